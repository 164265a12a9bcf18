"""Pieces of `cl/include` on a device, by themselves: a kernel of a test's own, its arrays in and out."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.conftest import ROOT

INCLUDE = re.compile(r'^#include "(\w+)\.h"\n', re.MULTILINE)


def with_header(name: str, kernel: str) -> str:
    """A kernel's text after that of a header, with the headers that this includes, each once."""
    seen: set[str] = set()

    def inline(match: re.Match[str]) -> str:
        stem = match.group(1)
        if stem in seen:
            return ""
        seen.add(stem)
        return INCLUDE.sub(inline, (ROOT / "cl" / "include" / f"{stem}.h").read_text(encoding="utf-8"))

    return INCLUDE.sub(inline, f'#include "{name}.h"\n') + kernel


def run_kernel(
    backend: Any, text: str, count: int, given: dict[str, NDArray[Any] | np.generic], made: dict[str, type]
) -> dict[str, NDArray[Any]]:
    """Run the only kernel of a text over `count` values, a multiple of 16, W at a time.

    `given` are its arguments in order; then come buffers of `count` values by name and type, which are returned.
    """
    cl, queue = backend._cl, backend._queue
    program = cl.Program(backend._context, text).build([f"-DW={backend.width}", "-cl-std=CL1.2"], cache_dir=False)
    (kernel,) = program.all_kernels()
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    out = {name: np.zeros(count, dtype) for name, dtype in made.items()}
    held = {name: cl.Buffer(backend._context, flags, hostbuf=values) for name, values in out.items()}
    arguments = [
        cl.Buffer(backend._context, flags, hostbuf=np.ascontiguousarray(value)) if np.ndim(value) else value
        for value in given.values()
    ]
    kernel(queue, (count // backend.width,), None, *arguments, *held.values())
    for name, values in out.items():
        cl.enqueue_copy(queue, values, held[name])
    return out
