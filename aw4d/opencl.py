"""OpenCL devices: finding every runtime, probing each device with a real kernel, choosing one."""

from __future__ import annotations

import ctypes
import logging
import os
import sys
import tempfile
import warnings
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from aw4d.errors import InputError
from aw4d.kernels import build

log = logging.getLogger("aw4d")
WIDTHS = (1, 4, 8, 16)
_SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
# Intel's runtime from PyPI lies in <prefix>/lib, where the dynamic loader does not look for what it depends on.
_INTEL_LIBRARY = "libintelocl.so"
_INTEL_NEEDS = ("libintlc.so.5", "libirng.so", "libsvml.so", "libimf.so")


def _intel_library() -> Path | None:
    path = Path(sys.prefix) / "lib" / _INTEL_LIBRARY
    return path if path.is_file() else None


@cache
def load() -> ModuleType:
    """Import pyopencl with every runtime in reach: the system's, and Intel's from PyPI where it is installed.

    Raises
    ------
    InputError
        pyopencl cannot be imported.
    """
    intel = _intel_library()
    if intel is None or "OCL_ICD_VENDORS" in os.environ or "pyopencl" in sys.modules:
        return _import_pyopencl()
    try:
        for name in _INTEL_NEEDS:
            ctypes.CDLL(str(intel.with_name(name)), mode=ctypes.RTLD_GLOBAL)
    except OSError as error:
        log.warning("Intel's OpenCL runtime is left out, it needs the package intel-cmplr-lib-rt (%s)", error)
        return _import_pyopencl()
    with tempfile.TemporaryDirectory(prefix="aw4d-icd-") as folder:
        (Path(folder) / "intel-pypi.icd").write_text(f"{intel}\n")
        for icd in _SYSTEM_VENDORS.glob("*.icd"):
            (Path(folder) / icd.name).write_text(icd.read_text())
        os.environ["OCL_ICD_VENDORS"] = folder
        cl = _import_pyopencl()
        try:
            cl.get_platforms()  # the loader reads the folder now, and only now
        except cl.Error:
            pass  # no platform at all is for the callers to report
        finally:
            del os.environ["OCL_ICD_VENDORS"]
    return cl


def _import_pyopencl() -> ModuleType:
    try:
        import pyopencl
    except ImportError as error:
        raise InputError(f"OpenCL: expected the package pyopencl, got {error}") from error
    # Runtimes write to the build log when all is well; what matters comes as an exception.
    warnings.filterwarnings("ignore", category=pyopencl.CompilerWarning)
    module: ModuleType = pyopencl
    return module


@dataclass(frozen=True, kw_only=True)
class DeviceReport:
    """One device; whether it works shows in a real build and run, when that is first asked."""

    index: int
    platform: str
    name: str
    kind: str
    version: str
    units: int
    width: int
    device: Any

    @cached_property
    def problem(self) -> str:
        """What went wrong in a build and run, in one line; empty where the device works."""
        return _probe(self)

    @cached_property
    def context(self) -> Any:
        """The probe's, kept: with its last context PoCL forgets its library of built-ins, which takes 0.4 s to read."""
        return load().Context([self.device])

    @property
    def usable(self) -> bool:
        """Whether a kernel was built, ran, and gave the right numbers."""
        return not self.problem

    @property
    def label(self) -> str:
        """One line for people."""
        return f"{self.name} ({self.platform}, {self.version})"


_PROBE = """
__kernel void probe(__global const float *a, __global float *out, const float k)
{
    const int i = get_global_id(0);
    out[i] = fma(a[i], k, exp(-a[i]));
}
"""


def first_error(error: Exception) -> str:
    """The line of a runtime's report that says what went wrong, or its first."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return next((line for line in lines if "error" in line.lower()), lines[0] if lines else repr(error))


def _probe(report: DeviceReport) -> str:
    """Build and run a kernel; what went wrong in one line, or nothing."""
    cl = load()
    try:
        context = report.context
        queue = cl.CommandQueue(context)
        (kernel,) = build(cl, context, report, _PROBE, ["-cl-kernel-arg-info"], ["probe"])
        a = np.linspace(0, 4, 64, dtype=np.float32)
        out = np.empty_like(a)
        flags = cl.mem_flags
        a_buffer = cl.Buffer(context, flags.READ_ONLY | flags.COPY_HOST_PTR, hostbuf=a)
        out_buffer = cl.Buffer(context, flags.WRITE_ONLY, out.nbytes)
        kernel.enqueue(queue, (a.size, 1), None, {"a": a_buffer, "out": out_buffer, "k": 3.0})
        cl.enqueue_copy(queue, out, out_buffer)
        expected = a.astype(np.float64) * 3 + np.exp(-a.astype(np.float64))
    except Exception as error:  # drivers fail in their own ways; each is a reason to refuse the device
        return first_error(error)
    wrong = float(np.abs(out - expected).max())
    return "" if wrong < 1e-5 else f"wrong numbers: a fused multiply-add and exp came out {wrong:g} off"


def vector_width(device: Any) -> int:
    """Compile-time width for a device: its native float width on a CPU, 1 elsewhere (a GPU's lanes are work-items)."""
    cl = load()
    if not device.type & cl.device_type.CPU:
        return 1
    return max(w for w in WIDTHS if w <= max(device.native_vector_width_float, 1))


def _kind(device: Any) -> str:
    kinds = load().device_type
    if device.type & kinds.GPU:
        return "gpu"
    return "cpu" if device.type & kinds.CPU else "accelerator"


@cache
def devices() -> tuple[DeviceReport, ...]:
    """Every device of every platform in the loader's order, which gives the indices of `--device`."""
    cl = load()
    try:
        platforms = cl.get_platforms()
    except cl.Error:  # the loader's way to say that there is no platform
        return ()
    reports: list[DeviceReport] = []
    for platform in platforms:
        try:
            found = platform.get_devices()
        except cl.Error:
            found = []
        for device in found:
            reports.append(
                DeviceReport(
                    index=len(reports),
                    platform=platform.name.strip(),
                    name=device.name.strip(),
                    kind=_kind(device),
                    version=device.driver_version.strip(),
                    units=device.max_compute_units,
                    width=vector_width(device),
                    device=device,
                )
            )
    return tuple(reports)


def choose(index: int | None = None) -> DeviceReport:
    """The device of that index, or the first usable one, GPUs first.

    Raises
    ------
    InputError
        There is no such device, or it does not work, or none does; says which and why.
    """
    reports = devices()
    if index is not None and reports:
        if not 0 <= index < len(reports):
            raise InputError(f"--device: expected 0 to {len(reports) - 1}, got {index} (see `aw4d doctor`)")
        if not reports[index].usable:
            raise InputError(f"--device {index}: {reports[index].label} does not work: {reports[index].problem}")
        return reports[index]
    for report in sorted(reports, key=lambda r: r.kind != "gpu"):
        if report.usable:  # those behind it are not tried
            return report
    why = "; ".join(f"{r.label}: {r.problem}" for r in reports) or "no platform was found"
    raise InputError(f"OpenCL: expected a device that builds and runs a kernel, got none ({why})")
