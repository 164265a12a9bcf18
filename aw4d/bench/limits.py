"""What a device can do at most: multiply-adds, copying, and built-ins a second."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.timing import seconds

RUNS = 5
ITEMS = 4096  # work-items of the kernels that only compute
FMA_STEPS, BUILTIN_STEPS = 20_000, 64
COPY_BYTES = 2**28  # far more than any cache holds

# Eight chains that do not wait for each other, each of a vector: enough to keep two units of a latency of four busy.
_FMA = """
__kernel void fma_rate(__global float16 *out, const int n)
{
    float16 a = (float16)(get_global_id(0)), b = a + 1, c = a + 2, d = a + 3;
    float16 e = a + 4, f = a + 5, g = a + 6, h = a + 7;
    const float16 k = 0.999f, m = 0.001f;
    for (int i = 0; i < n; i++) {
        a = fma(a, k, m); b = fma(b, k, m); c = fma(c, k, m); d = fma(d, k, m);
        e = fma(e, k, m); f = fma(f, k, m); g = fma(g, k, m); h = fma(h, k, m);
    }
    out[get_global_id(0)] = a + b + c + d + e + f + g + h;
}
"""

_COPY = """
__kernel void copy_rate(__global const float16 *from, __global float16 *to)
{
    const size_t i = get_global_id(0);
    to[i] = from[i];
}
"""

_BUILTIN = """
#define OF(x) (EXPRESSION)
__kernel void builtin_rate(__global float16 *out, const int n)
{
    float16 a = (float16)(get_global_id(0)) * 1e-4f + 0.1f, b = a + 0.1f, c = a + 0.2f, d = a + 0.3f;
    for (int i = 0; i < n; i++) { a = OF(a); b = OF(b); c = OF(c); d = OF(d); }
    out[get_global_id(0)] = a + b + c + d;
}
"""

# Each takes what it gave into its range again, whatever the number of steps.
BUILTINS = {
    "exp": "exp(-(x))",
    "exp2": "exp2(-(x))",
    "sqrt": "sqrt((x) + 0.5f)",
    "rsqrt": "rsqrt((x) + 0.5f)",
    "division": "1.5f / ((x) + 0.5f)",
    "pow": "pow((x) + 0.5f, (float16)(0.7f))",
    "sin": "sin(x) + 1.5f",
}


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Float32 operations (a multiply-add is two), bytes read and written, and built-ins a second."""

    device: str
    width: int
    fma_gflop_s: float
    copy_gb_s: float
    builtins_g_s: dict[str, float]

    def seconds(self, operations: float, nbytes: float) -> tuple[float, str]:
        """The least time that so much work can take [s], and which limit says so: "fma" or "copy"."""
        arithmetic, traffic = operations / self.fma_gflop_s / 1e9, nbytes / self.copy_gb_s / 1e9
        return (arithmetic, "fma") if arithmetic > traffic else (traffic, "copy")


class _Runner:
    """Builds and times small kernels on a backend's device, in a queue of their own."""

    def __init__(self, backend: OpenCLBackend) -> None:
        self.cl = opencl.load()
        self.context = self.cl.Context([backend.report.device])
        self.queue = self.cl.CommandQueue(self.context)

    def buffer(self, nbytes: int) -> object:
        """Memory of the device, all 1.0, so that it is there."""
        held = self.cl.Buffer(self.context, self.cl.mem_flags.READ_WRITE, nbytes)
        self.cl.enqueue_fill_buffer(self.queue, held, np.float32(1), 0, nbytes)
        self.queue.finish()
        return held

    def fastest(self, text: str, name: str, items: int, *arguments: object) -> float:
        """Least wall time of a kernel [s]."""
        kernel = self.cl.Kernel(self.cl.Program(self.context, text).build(cache_dir=False), name)

        def run() -> None:
            kernel(self.queue, (items,), None, *arguments)
            self.queue.finish()

        return min(seconds(run, RUNS + 1)[1:])

    def fastest_copy(self, source: object, target: object) -> float:
        """Least wall time of the runtime's own copy [s]."""

        def run() -> None:
            self.cl.enqueue_copy(self.queue, target, source)
            self.queue.finish()

        return min(seconds(run, RUNS + 1)[1:])


def fma_rate(backend: OpenCLBackend) -> float:
    """Float32 operations a second of eight independent chains of multiply-adds."""
    runner = _Runner(backend)
    took = runner.fastest(_FMA, "fma_rate", ITEMS, runner.buffer(ITEMS * 64), np.int32(FMA_STEPS))
    return ITEMS * FMA_STEPS * 8 * 16 * 2 / took


def copy_rate(backend: OpenCLBackend) -> float:
    """Bytes a second, read and written, of the faster of a kernel and the runtime's own copy."""
    runner = _Runner(backend)
    source, target = runner.buffer(COPY_BYTES), runner.buffer(COPY_BYTES)
    by_kernel = runner.fastest(_COPY, "copy_rate", COPY_BYTES // 64, source, target)
    return 2 * COPY_BYTES / min(by_kernel, runner.fastest_copy(source, target))


def builtin_rate(backend: OpenCLBackend, name: str) -> float:
    """Calls a second of a built-in, on vectors of 16."""
    runner = _Runner(backend)
    text = _BUILTIN.replace("EXPRESSION", BUILTINS[name])
    took = runner.fastest(text, "builtin_rate", ITEMS, runner.buffer(ITEMS * 64), np.int32(BUILTIN_STEPS))
    return ITEMS * BUILTIN_STEPS * 4 * 16 / took


def limits(backend: OpenCLBackend) -> Limits:
    """Measure all of them."""
    return Limits(
        device=backend.report.platform,
        width=backend.width,
        fma_gflop_s=fma_rate(backend) / 1e9,
        copy_gb_s=copy_rate(backend) / 1e9,
        builtins_g_s={name: builtin_rate(backend, name) / 1e9 for name in BUILTINS},
    )


def best(before: Limits, after: Limits) -> Limits:
    """The better of two measurements of a device, limit by limit: neither can be too high."""
    return Limits(
        device=before.device,
        width=before.width,
        fma_gflop_s=max(before.fma_gflop_s, after.fma_gflop_s),
        copy_gb_s=max(before.copy_gb_s, after.copy_gb_s),
        builtins_g_s={name: max(rate, after.builtins_g_s[name]) for name, rate in before.builtins_g_s.items()},
    )
