"""Built kernels: arguments by name, and the binaries of runtimes that keep none themselves."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aw4d import cache

KIND = "kernels"  # of the cache's files


class Target(Protocol):
    """What is known of a device and its driver."""

    @property
    def platform(self) -> str:
        """The driver's platform."""

    @property
    def name(self) -> str:
        """The device's name."""

    @property
    def kind(self) -> str:
        """`cpu`, `gpu` or `accelerator`."""

    @property
    def version(self) -> str:
        """The driver's version."""

    @property
    def device(self) -> Any:
        """The device itself."""


class Kernel:
    """A built kernel and the types of its arguments by name."""

    def __init__(self, cl: Any, kernel: Any, types: dict[str, str]) -> None:
        self._cl = cl
        self._kernel = kernel
        self.types = types
        self._set: dict[str, Any] = {}  # what the driver has been told: telling costs more than comparing

    def enqueue(
        self, queue: Any, size: tuple[int, int], group: tuple[int, int] | None, at_hand: dict[str, Any]
    ) -> None:
        """Set every argument and enqueue over (columns, rows) of work-items, in groups of that size or the driver's."""
        for i, (name, kind) in enumerate(self.types.items()):
            value = at_hand[name]
            if name in self._set and (self._set[name] is value if kind.endswith("*") else self._set[name] == value):
                continue
            self._kernel.set_arg(i, _converted(name, kind, value))
            self._set[name] = value
        self._cl.enqueue_nd_range_kernel(queue, self._kernel, size, group)


def _converted(name: str, kind: str, value: Any) -> Any:
    """The value as the driver takes it."""
    if kind.endswith("*"):
        return value
    if kind == "float3":
        return np.array([*value, 0], dtype=np.float32)
    if kind in ("float", "int"):
        return np.dtype(kind.replace("float", "float32").replace("int", "int32")).type(value)
    raise TypeError(f"{name}: arguments of type {kind} are not bound")


def build(
    cl: ModuleType, context: Any, target: Target, text: str, options: Sequence[str], names: Sequence[str]
) -> list[Kernel]:
    """Kernels of a program, from the cache where this device's driver has built the same before.

    Not pyopencl's own cache: a kernel out of a binary has lost its argument names on Intel's runtime, which keeps
    nothing itself. PoCL and the GPU drivers cache what they build.

    Parameters
    ----------
    cl, context, target
        pyopencl, context of one device, and what is known of it.
    text, options
        Source of the program, and how it is built; `-cl-kernel-arg-info` among it.
    names
        The kernels that are wanted, in the order in which they are returned.

    Raises
    ------
    pyopencl.Error
        The program cannot be built.
    """
    keeps = not (target.kind == "cpu" and "intel" in target.platform.lower())
    key = (target.platform, target.name, target.version, cpu(), text, list(options))
    if not keeps and (held := cache.read(KIND, key)) is not None:
        with contextlib.suppress(cl.Error, KeyError):  # else a binary that the runtime refuses: it is built anew
            program = cl.Program(context, [target.device], [held[_BINARY].tobytes()])
            program.build(list(options), cache_dir=False)
            return [Kernel(cl, cl.Kernel(program, name), dict(held[name].tolist())) for name in names]
    program = cl.Program(context, text).build(list(options), cache_dir=False)
    kernels = [cl.Kernel(program, name) for name in names]
    types = [_types(cl.kernel_arg_info, kernel) for kernel in kernels]
    if not keeps:
        binary = np.frombuffer(program.get_info(cl.program_info.BINARIES)[0], np.uint8)
        cache.write(KIND, key, {_BINARY: binary} | {name: _rows(of) for name, of in zip(names, types, strict=True)})
    return [Kernel(cl, kernel, of) for kernel, of in zip(kernels, types, strict=True)]


_BINARY = " binary"  # no name of a kernel


def cpu() -> str:
    """What this machine's processor can do: binaries of one that can do more would stop the program."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith(("flags", "Features")):
                return line
    return ""


def _types(info: Any, kernel: Any) -> dict[str, str]:
    """Types of a kernel's arguments by name, in order."""
    return {
        kernel.get_arg_info(i, info.NAME): kernel.get_arg_info(i, info.TYPE_NAME).replace(" ", "")
        for i in range(kernel.num_args)
    }


def _rows(types: dict[str, str]) -> NDArray[np.str_]:
    return np.array(list(types.items()), dtype=np.str_).reshape(-1, 2)
