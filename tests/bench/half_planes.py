"""What planes of float16 would give a pass that memory binds: time against error, for `harmonize`'s arithmetic.

Run as `python -m tests.bench.half_planes`. The planes are random: light from 0 to 1000 evenly in its logarithm, three
planes of the scene and three of the lamps. Error: as everywhere, against float64 on the same inputs before rounding.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.limits import copy_rate
from aw4d.bench.timing import seconds
from aw4d.compare import error
from reference_numpy.harmonize import harmonize

RUNS = 15
SHAPES = ((704, 1280), (2160, 3840))
STRENGTH, THRESHOLD = 0.5, 0.05

# Planes of one channel after the other; a half is read and written as a float.
_KERNEL = """
#ifdef HALF
#define PLANE half
#define LOAD(p) vload_half16(0, p)
#define STORE(x, p) vstore_half16_rte(x, 0, p)
#else
#define PLANE float
#define LOAD(p) vload16(0, p)
#define STORE(x, p) vstore16(x, 0, p)
#endif
__kernel void harmonize(
    __global PLANE *rgb, __global const PLANE *direct, const float strength, const float threshold, const int plane)
{
    const int i = 16 * get_global_id(0);
    const float16 r = LOAD(direct + i), g = LOAD(direct + i + plane), b = LOAD(direct + i + 2 * plane);
    const float16 seen = fmax((r + g + b) * (1.0f / 3.0f) - threshold, 0.0f);
    const float16 keep = 1.0f - clamp(strength * seen, 0.0f, 1.0f);
    STORE(fma(keep, LOAD(rgb + i), r), rgb + i);
    STORE(fma(keep, LOAD(rgb + i + plane), g), rgb + i + plane);
    STORE(fma(keep, LOAD(rgb + i + 2 * plane), b), rgb + i + 2 * plane);
}
"""


def _light(rng: np.random.Generator, shape: tuple[int, int]) -> NDArray[np.float32]:
    return np.exp(rng.uniform(np.log(1e-3), np.log(1e3), (3, *shape))).astype(np.float32)


def _run(
    backend: OpenCLBackend, rgb: NDArray[Any], direct: NDArray[Any], half: bool
) -> tuple[float, NDArray[np.float64]]:
    """Fastest run [s], and what it gives (3, H, W)."""
    cl = opencl.load()
    context = cl.Context([backend.report.device])
    queue = cl.CommandQueue(context)
    program = cl.Program(context, _KERNEL).build(["-DHALF"] * half, cache_dir=False)
    kernel = cl.Kernel(program, "harmonize")
    kept = np.float16 if half else np.float32
    source, lamps = (np.ascontiguousarray(values.astype(kept)) for values in (rgb, direct))
    flags = cl.mem_flags
    held = cl.Buffer(context, flags.READ_WRITE, source.nbytes)
    also = cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=lamps)
    plane = source[0].size

    def run() -> None:
        size = (plane // 16,)
        kernel(queue, size, None, held, also, np.float32(STRENGTH), np.float32(THRESHOLD), np.int32(plane))
        queue.finish()

    cl.enqueue_copy(queue, held, source)
    run()
    out = np.empty_like(source)
    cl.enqueue_copy(queue, out, held)
    return min(seconds(run, RUNS)), out.astype(np.float64)


def main() -> None:
    """Measure and print."""
    for report in opencl.devices():
        if not report.usable:
            continue
        backend = OpenCLBackend(report.index)
        print(f"{backend.name}: copies {copy_rate(backend) / 1e9:.0f} GB/s")
        for shape in SHAPES:
            rng = np.random.default_rng(1)
            rgb, direct = _light(rng, shape), _light(rng, shape)
            lit, lamps = (np.moveaxis(values.astype(np.float64), 0, -1) for values in (rgb, direct))
            both = harmonize(rgb=lit, direct=lamps, strength=STRENGTH, threshold=THRESHOLD, convention="physical")
            expected = np.moveaxis(both["rgb"], -1, 0)
            for half in (False, True):
                took, got = _run(backend, rgb, direct, half)
                most, p9999 = error(got, expected)
                rate = 9 * rgb[0].size * (2 if half else 4) / took / 1e9
                print(
                    f"  {shape[1]}x{shape[0]} float{16 if half else 32}: {took * 1e3:.2f} ms, {rate:.0f} GB/s, "
                    f"error {most:.1e}, 99.99th percentile {p9999:.1e}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
