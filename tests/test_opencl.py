"""OpenCL as users have it: no runtime, runtimes that do not work, devices that were asked for, paths with spaces."""

from __future__ import annotations

import io
import logging
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from aw4d import backend_opencl, doctor, opencl
from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.ingest import ingest_street
from aw4d.lights.light import in_camera
from aw4d.params import FogParams, param
from aw4d.passes import PASSES
from aw4d.render import open_backend
from aw4d.scene import Scene
from tests.fog_inputs import all_kinds, frame, on, reference

ROOT = Path(__file__).resolve().parent.parent


def params(**changes: Any) -> FogParams:
    return FogParams(**({"color": (0.5, 0.55, 0.6)} | changes))


# ---- no runtime at all -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One small frame of the street."""
    path = tmp_path_factory.mktemp("street") / "clip"
    ingest_street(path, frames=1, width=64, height=36, workers=1)
    return path


@pytest.fixture
def without_runtime(tmp_path: Path) -> dict[str, str]:
    """The environment of a machine that has no OpenCL runtime."""
    (tmp_path / "vendors").mkdir()
    return os.environ | {"OCL_ICD_VENDORS": str(tmp_path / "vendors"), "COLUMNS": "300"}


def _aw4d(environment: dict[str, str], *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "aw4d.cli", *map(str, words)]
    return subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)


def test_doctor_without_a_runtime_says_how_to_get_one(without_runtime: dict[str, str]) -> None:
    done = _aw4d(without_runtime, "doctor")
    assert done.returncode == 1
    assert done.stdout == doctor.HOW_TO_GET_ONE + "\n"
    assert done.stderr == ""


@pytest.mark.parametrize("choice", [("--backend", "opencl"), ("--device", "0")])
def test_opencl_without_a_runtime_is_refused(
    without_runtime: dict[str, str], clip: Path, tmp_path: Path, choice: tuple[str, str]
) -> None:
    done = _aw4d(without_runtime, "edit", clip, "--weather", "fog", *choice, "-o", tmp_path / "out.mp4")
    assert done.returncode == 2
    assert re.fullmatch(r"aw4d: OpenCL: .*no platform was found.*\n", done.stderr)
    assert done.stdout == ""
    assert not (tmp_path / "out.mp4").exists()


def test_auto_without_a_runtime_runs_on_numpy_and_says_so(
    without_runtime: dict[str, str], clip: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.mp4"
    done = _aw4d(without_runtime, "edit", clip, "--weather", "fog", "-o", out)
    assert done.returncode == 0, done.stderr
    assert "running on NumPy" in done.stderr
    assert done.stdout == f"{out}\n"
    assert '"backend": "numpy' in out.with_suffix(".json").read_text(encoding="utf-8")


# ---- runtimes that list a device which does not work -----------------------------------------------------------------

BROKEN = {
    "does not build": ("__kernel void probe(__global const float *a,", "error"),
    "lacks the kernel": ("__kernel void other(void) {}", "INVALID_KERNEL_NAME"),
    "computes nonsense": (opencl._PROBE.replace("fma(a[i], k,", "fma(a[i], -k,"), "wrong numbers"),
    "computes no numbers": (opencl._PROBE.replace("exp(-a[i])", "NAN"), "wrong numbers"),
}


@pytest.fixture(params=BROKEN)
def broken(
    request: pytest.FixtureRequest, opencl_device: OpenCLBackend, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """Every device fails its probe; gives what must be said of it."""
    text, reason = BROKEN[request.param]
    monkeypatch.setattr(opencl, "_PROBE", text)
    opencl.devices.cache_clear()
    yield reason
    opencl.devices.cache_clear()


def test_a_device_that_fails_its_probe_is_refused(broken: str) -> None:
    assert all(broken in report.problem and not report.usable for report in opencl.devices())
    with pytest.raises(InputError, match=broken):
        opencl.choose()


def test_doctor_says_why_a_device_is_refused(broken: str) -> None:
    out = io.StringIO()
    assert not doctor.report(Console(file=out))
    refusals = [line for line in out.getvalue().splitlines() if "refused: " in line]
    assert len(refusals) == len(opencl.devices())
    assert all(broken in line for line in refusals)
    assert doctor.HOW_TO_GET_ONE in out.getvalue()


@pytest.mark.parametrize(("name", "device"), [("opencl", None), ("opencl", 0), ("auto", 0)])
def test_a_device_that_was_asked_for_is_not_changed_for_another(broken: str, name: str, device: int | None) -> None:
    with pytest.raises(InputError, match=broken):
        open_backend(name, device)


def test_auto_takes_numpy_where_no_device_works_and_says_why(broken: str, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="aw4d"):  # an earlier --quiet may have silenced it
        assert isinstance(open_backend("auto"), NumpyBackend)
    assert "NumPy" in caplog.text
    assert broken in caplog.text


def test_doctor_prints_what_a_compiler_says_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    said = "error: [/usr/include] [bold] is no target"
    device = opencl.DeviceReport(
        index=0, platform="P [x]", name="D", kind="cpu", version="1", units=1, width=1, device=None
    )
    monkeypatch.setattr(opencl, "_probe", lambda device: said)
    monkeypatch.setattr(opencl, "devices", lambda: (device,))
    out = io.StringIO()
    assert not doctor.report(Console(file=out))
    assert said in out.getvalue()
    assert "P [x]" in out.getvalue()


def test_intels_runtime_without_its_libraries_is_left_out_and_named(tmp_path: Path) -> None:
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libintelocl.so").touch()
    code = f"import logging, sys; logging.basicConfig(); sys.prefix = {str(tmp_path)!r}\n"
    code += "from aw4d import opencl; opencl.load()"
    environment = {name: value for name, value in os.environ.items() if name != "OCL_ICD_VENDORS"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "intel-cmplr-lib-rt" in done.stderr


# ---- choosing ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [-1, 99])
def test_a_device_that_is_not_there_is_refused(opencl_device: OpenCLBackend, index: int) -> None:
    last = len(opencl.devices()) - 1
    with pytest.raises(InputError, match=f"--device: expected 0 to {last}, got {index}"):
        open_backend("opencl", index)


def test_the_device_that_was_asked_for_is_taken(opencl_device: OpenCLBackend) -> None:
    index = opencl_device.report.index
    chosen = open_backend("auto", index)
    assert isinstance(chosen, OpenCLBackend)
    assert chosen.report.index == index


def test_gpus_go_first_and_broken_devices_never(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass
    class Fake:
        index: int
        kind: str
        problem: str = ""

        @property
        def usable(self) -> bool:
            return not self.problem

    found = (Fake(0, "cpu"), Fake(1, "gpu", "no target"), Fake(2, "gpu"))
    monkeypatch.setattr(opencl, "devices", lambda: found)
    assert opencl.choose().index == 2
    monkeypatch.setattr(opencl, "devices", lambda: found[:2])
    assert opencl.choose().index == 0


def test_the_environment_is_left_as_it_was(opencl_device: OpenCLBackend) -> None:
    code = (
        "import os; before = dict(os.environ)\nfrom aw4d import opencl; opencl.devices()\nassert os.environ == before"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


# ---- building and binding ----------------------------------------------------------------------------------------


def test_every_width_builds_with_and_without_layers(opencl_backend: OpenCLBackend) -> None:
    source = frame(19, 3)
    with_layers = on(opencl_backend, source, all_kinds(), params())["rgb"]
    planes = opencl_backend.upload(source, Scene(lights=in_camera(all_kinds(), source.camera)))
    opencl_backend.run("fog", planes, params())
    assert np.allclose(opencl_backend.download(planes, ["rgb"])["rgb"], with_layers, rtol=1e-6)
    assert np.allclose(with_layers, reference(source, all_kinds(), params())["rgb"], rtol=1e-5)


def test_a_width_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match=r"width: .* got 3"):
        OpenCLBackend(width=3)


@pytest.mark.parametrize("name", PASSES)
def test_a_kernel_is_one_text_with_each_header_once(name: str) -> None:
    text = backend_opencl.source(name)
    assert "#include" not in text
    assert text.count("typedef float floatw;") == 1


def test_kernels_build_from_an_environment_whose_path_has_a_space(opencl_device: OpenCLBackend, tmp_path: Path) -> None:
    if sys.prefix == sys.base_prefix:
        pytest.skip("not in a virtual environment, so there is none to give another path")
    home = tmp_path / "a user's größe"
    home.mkdir()
    (home / "venv").symlink_to(sys.prefix)
    python = home / "venv" / Path(sys.executable).relative_to(sys.prefix)
    code = (
        "import sys; from aw4d.backend_opencl import OpenCLBackend; from tests.fog_inputs import *\n"
        "assert ' ' in sys.prefix\n"
        f"on(OpenCLBackend({opencl_device.report.index}), frame(8, 8), [], FogParams(color=(1, 1, 1)))"
    )
    done = subprocess.run([str(python), "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@dataclass(frozen=True, kw_only=True)
class WiderFogParams(FogParams):
    """Fog with a parameter that no pass takes."""

    smell: float = param(0.0, "1", "the smell", "")


@pytest.fixture(params=["numpy", "opencl"])
def backend(request: pytest.FixtureRequest, opencl_device: OpenCLBackend) -> NumpyBackend | OpenCLBackend:
    """Either backend."""
    return opencl_device if request.param == "opencl" else NumpyBackend()


def test_a_parameter_that_a_pass_does_not_take_is_an_error(backend: NumpyBackend | OpenCLBackend) -> None:
    source = frame(8, 8)
    planes = backend.upload(source, Scene(lights=in_camera([], source.camera)))
    with pytest.raises(TypeError, match="fog: does not take the parameters smell"):
        backend.run("fog", planes, WiderFogParams(color=(1, 1, 1)))


def test_frames_that_are_begun_before_others_are_waited_for_come_out_as_alone(
    backend: NumpyBackend | OpenCLBackend,
) -> None:
    sources = [frame(40, 9, seed=seed) for seed in range(4)]

    def begun(source: GBuffer) -> Callable[[], dict[str, Any]]:
        planes = backend.upload(source, Scene(lights=in_camera(all_kinds(), source.camera)))
        backend.run("fog", planes, params())
        return backend.fetch(planes, ["rgb"])

    alone = [begun(source)()["rgb"] for source in sources]
    for together, expected in zip([begun(source) for source in sources], alone, strict=True):
        assert np.array_equal(together()["rgb"], expected)


def test_an_argument_that_nothing_gives_is_an_error(backend: NumpyBackend | OpenCLBackend) -> None:
    source = frame(8, 8)
    planes = backend.upload(source, Scene(lights=in_camera([], source.camera)))
    held: dict[str, Any] = planes.buffers if isinstance(backend, OpenCLBackend) else planes.arrays  # type: ignore[union-attr]
    del held["depth"]
    with pytest.raises(TypeError, match="fog: takes depth"):
        backend.run("fog", planes, params())
