"""The OpenCL backend: planar planes padded to the vector width, kernels built once, arguments bound by name."""

from __future__ import annotations

import contextlib
import os
import re
import weakref
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache, partial, wraps
from importlib import resources
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from aw4d import cache as on_disk
from aw4d import opencl
from aw4d.backend import Planes, Twin, check_names, frame_arguments, own_arguments, unwritable
from aw4d.channels import by_pixels, write_planar
from aw4d.errors import InputError, JobError
from aw4d.gbuffer import GBuffer
from aw4d.kernels import Kernel, build, cpu
from aw4d.lights.light import balls, shapes
from aw4d.pages import LARGE, in_large_pages
from aw4d.params import CONVENTIONS, Params
from aw4d.passes import (
    BAND,
    CHUNKS,
    DIGITS,
    EMPTY,
    GROUP_ITEMS,
    GROUPS,
    IMAGE,
    PACK,
    PASSES,
    RECORD,
    SHARES,
    SHOW,
    TILE,
    Stage,
    held_as,
    stages,
)
from aw4d.scene import Scene
from reference_numpy.sampling import gauss_legendre

P = ParamSpec("P")
R = TypeVar("R")
POCL = "Portable Computing Language"  # its platform's name
ASKED = "asked"  # of the cache's files: passes that PoCL has been asked for
GO_ON = "try again, or choose another with --device (see `aw4d doctor`) or --backend numpy"
LESS = "what helps is a clip of smaller frames, another --device (see `aw4d doctor`) or --backend numpy"
_INCLUDE = re.compile(r'^#include "(?:include/)?(\w+\.h)"\n', re.MULTILINE)


@cache
def source(name: str) -> str:
    """Text of `cl/<name>.cl` with its headers inlined, each once: a path with a space breaks -I on PoCL."""
    folder = resources.files("cl")
    seen: set[str] = set()

    def inline(match: re.Match[str]) -> str:
        header = match.group(1)
        if header in seen:
            return ""
        seen.add(header)
        return _INCLUDE.sub(inline, folder.joinpath("include", header).read_text(encoding="utf-8"))

    return _INCLUDE.sub(inline, folder.joinpath(f"{name}.cl").read_text(encoding="utf-8"))


@cache
def _node_tables(nodes: int) -> dict[str, NDArray[np.float32]]:
    """Places and weights of the upper half of the nodes; the same arrays every time, so that they are copied once."""
    tables = (half[nodes // 2 :].astype(np.float32) for half in gauss_legendre(nodes))
    return dict(zip(("node_x", "node_w"), map(unwritable, tables), strict=True))


def scalar_arguments(p: Params) -> dict[str, Any]:
    """Parameters as a kernel takes them: names of conventions as numbers, node counts as tables."""
    out: dict[str, Any] = {}
    for name, value in p.arguments().items():
        if name == "convention":
            out[name] = CONVENTIONS.index(value)
        elif name == "nodes":
            out |= _node_tables(value) | {"node_pairs": value // 2}
        else:
            out[name] = value
    return out


@dataclass(kw_only=True)
class OpenCLPlanes:
    """Planes on the device: rows padded to `pitch`, channels `plane` values apart."""

    shape: tuple[int, int]
    pitch: int
    buffers: dict[str, Any]
    layers: frozenset[str]
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def plane(self) -> int:
        """Values from one channel to the next."""
        return self.pitch * self.shape[0]


@dataclass
class _Set:
    """Buffers of an uploaded frame by name, and the event after which no pass works on them."""

    buffers: dict[str, Any] = field(default_factory=dict)
    used: Any = None


def _told(method: Callable[Concatenate[OpenCLBackend, P], R]) -> Callable[Concatenate[OpenCLBackend, P], R]:
    """The method; whatever the runtime raises in it, at once or about work that it took before, is a JobError."""

    @wraps(method)
    def call(backend: OpenCLBackend, /, *args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return method(backend, *args, **kwargs)
        except opencl.load().Error as error:
            raise backend.failure(error) from error

    return call


class OpenCLBackend:
    """Runs `cl/<name>.cl` on one device.

    Parameters
    ----------
    device
        Index as `aw4d doctor` numbers them; the first usable one by default.
    width
        Vector width 1, 4, 8 or 16; the device's own by default.

    Raises
    ------
    InputError
        The device does not exist or does not work.
    """

    def __init__(self, device: int | None = None, width: int | None = None) -> None:
        if width is not None and width not in opencl.WIDTHS:
            raise InputError(f"width: expected one of {opencl.WIDTHS}, got {width}")
        self._cl = opencl.load()
        self.report = opencl.choose(device)
        self.width = width if width is not None else self.report.width
        self._band = BAND if self.report.kind == "cpu" else TILE
        self._context = self._cl.Context([self.report.device])
        self._queue = self._cl.CommandQueue(self._context)
        self._uploads = self._cl.CommandQueue(self._context)
        self._sets = (_Set(), _Set())  # one is filled with a frame while passes work on the other
        self._constants: dict[str, tuple[NDArray[Any], Any]] = {}
        self._kernels: dict[tuple[str, bool], list[Kernel]] = {}
        self._begun: dict[tuple[str, bool], Future[list[Kernel]]] = {}
        self._builders = ThreadPoolExecutor(os.cpu_count(), thread_name_prefix="build")
        self._pool: dict[str, Any] = {}

    @property
    def name(self) -> str:
        """Device, vendor, version, width."""
        return f"opencl {self.report.label}, float32 x {self.width}"

    def _buffer(self, name: str, nbytes: int, pool: dict[str, Any] | None = None) -> Any:
        """A buffer of that name, of that size or more, kept from frame to frame."""
        pool = self._pool if pool is None else pool
        held = pool.get(name)
        if held is None or held.size < nbytes:
            try:
                held = self._new_buffer(nbytes)
            except (self._cl.Error, OSError) as error:
                reason = opencl.first_error(error)
                raise JobError(
                    f"{self.report.label}: no {nbytes / 1e6:.0f} MB for {name} beside {self._held():.0f} MB in use "
                    f"({reason}); {LESS}"
                ) from error
            pool[name] = held
        return held

    def _new_buffer(self, nbytes: int) -> Any:
        """A buffer; a CPU's in large pages, if it fills one; they go with it, but not before the work on it is done."""
        flags = self._cl.mem_flags
        if self.report.kind != "cpu" or nbytes < LARGE:
            return self._cl.Buffer(self._context, flags.READ_WRITE, nbytes)
        memory = in_large_pages(nbytes)
        weakref.finalize(memory, _done, self._queue, self._uploads)
        return self._cl.Buffer(self._context, flags.READ_WRITE | flags.USE_HOST_PTR, hostbuf=memory)

    def _held(self) -> float:
        """Memory that the buffers take [MB]."""
        pools = (self._pool, *(one.buffers for one in self._sets))
        return sum(buffer.size for pool in pools for buffer in pool.values()) / 1e6

    def failure(self, error: Exception) -> JobError:
        """What the runtime raised, in one line with how to go on; no other device takes over by itself."""
        reason = opencl.first_error(error)
        if isinstance(error, self._cl.MemoryError):
            return JobError(f"{self.report.label}: out of memory with {self._held():.0f} MB in use ({reason}); {LESS}")
        return JobError(f"{self.report.label}: the device failed or was lost ({reason}); {GO_ON}")

    def _to_device(self, name: str, values: NDArray[Any]) -> Any:
        data = np.ascontiguousarray(values)
        buffer = self._buffer(name, max(data.nbytes, 4))  # no runtime takes an empty buffer
        if data.nbytes:
            self._cl.enqueue_copy(self._queue, buffer, data)
        return buffer

    def _constant(self, name: str, values: NDArray[Any]) -> Any:
        """A buffer of an array that nobody can write to; copied once for all the frames that share the array."""
        if name not in self._constants or self._constants[name][0] is not values:
            flags = self._cl.mem_flags.READ_ONLY | self._cl.mem_flags.COPY_HOST_PTR
            self._constants[name] = values, self._cl.Buffer(self._context, flags, hostbuf=np.ascontiguousarray(values))
        return self._constants[name][1]

    def _next_set(self) -> dict[str, Any]:
        """Buffers that no pass works on any more: those of the upload before the last one."""
        last, free = self._sets
        last.used = self._cl.enqueue_marker(self._queue)
        self._queue.flush()
        if free.used is not None:
            free.used.wait()
        self._sets = free, last
        return free.buffers

    def _filled(self, name: str, values: NDArray[Any], pool: dict[str, Any]) -> Any:
        """A buffer with an array in it, whatever the passes do meanwhile."""
        if values.size and not values.flags.writeable:
            return self._constant(name, values)
        buffer = self._buffer(name, max(values.nbytes, 4), pool)  # no runtime takes an empty buffer
        if values.nbytes:
            self._cl.enqueue_copy(self._uploads, buffer, np.ascontiguousarray(values))
        return buffer

    def _plane(self, name: str, values: NDArray[Any], pitch: int, pool: dict[str, Any]) -> Any:
        """A buffer with a plane, written in place: channel after channel, rows padded with their last pixel's value."""
        values = values.view(np.uint8) if values.dtype == np.bool_ else values
        height, width, *channels = values.shape
        buffer = self._buffer(name, values.nbytes // width * pitch, pool)
        there, _ = self._cl.enqueue_map_buffer(
            *(self._uploads, buffer, self._cl.map_flags.WRITE_INVALIDATE_REGION, 0),
            *((*(channels or (1,)), height, pitch), values.dtype),
        )
        write_planar(values, there[..., :width])
        there[..., width:] = there[..., width - 1 : width]
        there.base.release(self._uploads)
        return buffer

    @_told
    def upload(self, frame: GBuffer, scene: Scene, layers: Sequence[str] = ()) -> OpenCLPlanes:
        """Take a frame, while the passes of the frame before may still run."""
        height, width = frame.camera.shape
        pitch = -(-width // self.width) * self.width
        pool = self._next_set()
        buffers = {name: self._plane(name, frame[name], pitch, pool) for name in frame}
        arguments: dict[str, Any] = {"light_count": len(scene.lights), "width": width, "height": height}
        prepared = {"light_ball": balls(scene.lights), "light_shape": shapes(scene.lights)}
        given = frame_arguments(frame, scene) | prepared
        for name, value in given.items():
            arguments[name] = self._filled(name, np.asarray(value), pool) if np.ndim(value) else value
        self._uploads.finish()
        planes = OpenCLPlanes(
            shape=(height, width), pitch=pitch, buffers=buffers, layers=frozenset(layers), arguments=arguments
        )
        planes.arguments |= {"pitch": pitch, "plane": planes.plane}
        return planes

    @_told
    def put(self, planes: Planes, name: str, values: NDArray[Any]) -> None:
        """Replace a plane, (H, W) or (H, W, 3)."""
        assert isinstance(planes, OpenCLPlanes)
        planes.buffers[name] = self._to_device(name, _planar(values, planes.pitch))

    def keep(self, planes: OpenCLPlanes, names: Sequence[str]) -> dict[str, Any]:
        """Copies of planes on the device, those that are there, for `restore`: of the frame, not of all that a buffer
        has room for, which would empty the caches when it is brought back."""
        kept = {}
        for name in planes.buffers.keys() & set(names):
            channels, dtype = held_as(name)
            nbytes = np.dtype(dtype).itemsize * channels * planes.plane
            kept[name] = self._cl.Buffer(self._context, self._cl.mem_flags.READ_WRITE, nbytes)
            self._cl.enqueue_copy(self._queue, kept[name], planes.buffers[name], byte_count=nbytes)
        return kept

    def restore(self, planes: OpenCLPlanes, kept: dict[str, Any]) -> None:
        """Bring planes back to what they were when they were kept."""
        for name, buffer in kept.items():
            self._cl.enqueue_copy(self._queue, planes.buffers[name], buffer)
        self.finish()

    def prepare(self, names: Sequence[str], layers: Sequence[str] = ()) -> None:
        """Start to build the kernels of the passes, side by side."""
        for name in names:
            key = (name, _with_layers(name, layers))
            if key not in self._kernels and key not in self._begun:
                self._begun[key] = self._builders.submit(self._build, *key)

    def twin(self, names: Sequence[str], layers: Sequence[str], shape: tuple[int, int]) -> Twin | None:
        """Itself where it compiles kernels one at a time and has never been asked for these: on PoCL.

        That it was asked is noted on disk: where that cannot be, PoCL will not keep what it compiles either.
        """
        if self.report.platform != POCL or _cores() < 2:
            return None
        built = [(source(name), self._options(_with_layers(name, layers))) for name in names]
        key = (self.report.version, cpu(), os.environ.get("POCL_CACHE_DIR"), built, shape)
        if on_disk.read(ASKED, key) is not None:
            return None
        on_disk.write(ASKED, key, {})
        return None if on_disk.read(ASKED, key) is None else Twin(self.report.index, self.width)

    def _built(self, name: str, layers: bool) -> list[Kernel]:
        """Kernels of a pass; what nobody has begun is built here: Oclgrind's compiler crashes in another thread."""
        key = (name, layers)
        if key not in self._kernels:
            begun = self._begun.pop(key, None)
            self._kernels[key] = self._build(name, layers) if begun is None else begun.result()
        return self._kernels[key]

    def _build(self, name: str, layers: bool) -> list[Kernel]:
        """The kernels of a pass in order."""
        wanted = [stage.kernel for stage in stages(name)]
        try:
            return build(self._cl, self._context, self.report, source(name), self._options(layers), wanted)
        except self._cl.Error as error:
            reason = opencl.first_error(error)
            raise InputError(f"{self.report.label}: the kernel {name} cannot be built ({reason})") from error

    def _options(self, layers: bool) -> list[str]:
        options = ["-cl-std=CL1.2", "-cl-kernel-arg-info", f"-DW={self.width}", f"-DTILE={TILE}"]
        options += [f"-DBAND={self._band}"]
        options += [f"-DCHUNKS={CHUNKS}", f"-DDIGITS={DIGITS}", f"-DRECORD={RECORD}", f"-DPACK={PACK}"]
        return options + ["-DLAYERS"] * layers

    @_told
    def run(self, name: str, planes: Planes, p: Params) -> None:
        """Enqueue the kernels of `cl/<name>.cl`; every argument is found by its name.

        Raises
        ------
        TypeError
            A kernel takes an argument that neither frame nor parameters have, or none takes a parameter.
        """
        assert isinstance(planes, OpenCLPlanes)
        wanted_layers = PASSES[name].layers if planes.layers & PASSES[name].layers.keys() else {}
        kernels = self._built(name, bool(wanted_layers))
        new = {plane: held_as(plane)[0] for plane in PASSES[name].writes if plane not in planes.buffers}
        for plane, channels in (wanted_layers | new).items():
            planes.buffers[plane] = self._buffer(plane, 4 * channels * planes.plane)
        for plane in set(PASSES[name].optional) - planes.buffers.keys():
            channels, dtype = held_as(plane)
            planes.buffers[plane] = self._buffer(plane, np.dtype(dtype).itemsize * channels * planes.plane)
            value: NDArray[Any] = np.array(EMPTY.get(plane, 0), dtype)
            self._cl.enqueue_fill_buffer(self._queue, planes.buffers[plane], value, 0, planes.buffers[plane].size)
        own = scalar_arguments(p)
        tables = {
            key: self._constant(f"{name}.{key}", value) for key, value in own.items() if isinstance(value, np.ndarray)
        }
        given = own_arguments(name, planes.arguments)
        count = given[PASSES[name].counts]
        at_hand = planes.buffers | given | own | tables | self._scratch(name, planes, count)
        check_names(name, {argument for kernel in kernels for argument in kernel.types}, set(at_hand), set(own))
        for stage, kernel in zip(stages(name), kernels, strict=True):
            kernel.enqueue(self._queue, *self._size(stage, planes, count), at_hand)

    def _scratch(self, name: str, planes: OpenCLPlanes, count: int) -> dict[str, Any]:
        """Buffers that the stages of a pass share, kept from frame to frame."""
        size = (planes.shape[0], planes.pitch, count)
        return {key: self._buffer(key, max(4 * values(*size), 4)) for key, values in PASSES[name].scratch.items()}

    def _size(self, stage: Stage, planes: OpenCLPlanes, count: int) -> tuple[tuple[int, int], tuple[int, int] | None]:
        """Work-items of a stage, and how many a group holds; None: the driver chooses.

        A CPU takes two rows of pixels a group: a few hundred groups balance its cores.
        """
        height, width = planes.shape
        if stage.over == "one":
            return (1, 1), (1, 1)
        if stage.over == "groups":
            items = 1 if self.report.kind == "cpu" else GROUP_ITEMS
            return (items, min(GROUPS, height)), (items, 1)
        if stage.over == "tiles":
            columns = -(-width // (TILE * self.width))
            fits = self.report.kind == "cpu" and columns <= self.report.device.max_work_group_size
            return (columns, -(-height // TILE)), (columns, 1) if fits else None
        if stage.over == "particles" and self.report.kind == "cpu":
            return (min(max(-(-count // self.width), 1), SHARES), 1), (1, 1)
        if stage.over == "particles":
            groups = max(-(-count // (self.width * GROUP_ITEMS)), 1)
            return (groups * GROUP_ITEMS, 1), (GROUP_ITEMS, 1)
        if stage.over == "chunks":
            return (CHUNKS, 1), None
        # Alone on a CPU: in a group of the driver's choice what strips hold is too much for a stack, and a prime number
        # of packs is a single group.
        alone = (1, 1) if self.report.kind == "cpu" else None
        if stage.over == "packs":
            return (max(-(-count // (self.width * PACK)), 1), 1), alone
        columns = planes.pitch // self.width
        if stage.over == "bands":
            return (columns, -(-height // self._band)), alone
        if stage.over == "strips":
            return (columns, -(-height // TILE)), alone
        fits = self.report.kind == "cpu" and height % 2 == 0 and 2 * columns <= self.report.device.max_work_group_size
        return (columns, height), (columns, 2) if fits else None

    @_told
    def finish(self) -> None:
        """Wait until the device has done all that was asked of it."""
        self._queue.finish()

    def scratch(self, name: str, planes: Planes, buffer: str) -> NDArray[np.uint32] | None:
        """What the stages of a pass that has just run left in a buffer that they share, 32 bits a value."""
        assert isinstance(planes, OpenCLPlanes)
        count = own_arguments(name, planes.arguments)[PASSES[name].counts]
        values = np.empty(PASSES[name].scratch[buffer](planes.shape[0], planes.pitch, count), dtype=np.uint32)
        if values.size:
            self._cl.enqueue_copy(self._queue, values, self._pool[buffer])
        return values

    @_told
    def download(self, planes: Planes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Planes, layers and the image by name, without their padding, (H, W) or (H, W, 3)."""
        return self.fetch(planes, names)()

    @_told
    def fetch(self, planes: Planes, names: Sequence[str]) -> Callable[[], dict[str, NDArray[Any]]]:
        """Enqueue the copies of planes, layers and the image; what is returned waits for them."""
        assert isinstance(planes, OpenCLPlanes)
        if IMAGE in names:
            self._show(planes)
        copies: dict[str, tuple[NDArray[Any], Any]] = {}
        for name in names:
            channels, dtype = held_as(name)
            padded: NDArray[Any] = np.empty((channels, planes.shape[0], planes.pitch), dtype)
            copies[name] = padded, self._cl.enqueue_copy(self._queue, padded, planes.buffers[name], is_blocking=False)
        self._queue.flush()
        return partial(self._arrived, copies, planes.shape[1])

    def _show(self, planes: OpenCLPlanes) -> None:
        """Enqueue what makes the image of `rgb`."""
        planes.buffers[IMAGE] = self._buffer(IMAGE, 3 * planes.plane)
        for stage, kernel in zip(stages(SHOW), self._built(SHOW, layers=False), strict=True):
            kernel.enqueue(self._queue, *self._size(stage, planes, 0), planes.buffers | planes.arguments)

    @_told
    def _arrived(self, copies: dict[str, tuple[NDArray[Any], Any]], width: int) -> dict[str, NDArray[Any]]:
        """What was copied from the device, without its padding."""
        out = {}
        for name, (padded, copied) in copies.items():
            copied.wait()
            out[name] = by_pixels(padded[:, :, :width])
        return out


def _done(*queues: Any) -> None:
    """Wait until nothing that was asked for is left to do; a device that was lost does nothing more."""
    for queue in queues:
        with contextlib.suppress(opencl.load().Error):
            queue.finish()


def _cores() -> int:
    """Cores that this process may use; all where the system does not say."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _with_layers(name: str, layers: Sequence[str]) -> bool:
    """Whether a pass gives any of the layers."""
    return name != SHOW and not PASSES[name].layers.keys().isdisjoint(layers)


def _planar(values: NDArray[Any], pitch: int) -> NDArray[Any]:
    """A plane channel after channel, rows padded with their last pixel's value; masks as bytes."""
    planar = values[None] if values.ndim == 2 else np.moveaxis(values, -1, 0)
    padded = np.pad(planar, ((0, 0), (0, 0), (0, pitch - values.shape[1])), mode="edge")
    return padded.view(np.uint8) if padded.dtype == np.bool_ else padded
