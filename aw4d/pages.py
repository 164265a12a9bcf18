"""Memory in large pages: a kernel reads sixteen planes side by side, each with addresses of its own to translate."""

from __future__ import annotations

import contextlib
import mmap
from itertools import count

import numpy as np
from numpy.typing import NDArray

LARGE = 1 << 21  # [B] a large page of x86-64 and of most others
LINE = 64  # [B] runtimes copy memory that is no whole number of cache lines
STEP, STEPS = 4096, 16  # [B] planes that all began at a large page would meet in the same sets of the second cache

_taken = count()


def in_large_pages(nbytes: int) -> NDArray[np.uint8]:
    """Memory of that size or a little more, zeros, in large pages where the system has them.

    Raises
    ------
    OSError
        There is not so much.
    """
    later = next(_taken) % STEPS * STEP
    held = mmap.mmap(-1, nbytes + LINE + LARGE + later)
    memory = np.frombuffer(held, np.uint8)
    start = -memory.ctypes.data % LARGE
    with contextlib.suppress(AttributeError, OSError):  # a system without them
        # Whole ones alone: one that is begun would be filled up some seconds later, and be memory in use.
        held.madvise(mmap.MADV_HUGEPAGE, start, (later + nbytes) // LARGE * LARGE)
    return memory[start + later : start + later + -(-nbytes // LINE) * LINE]
