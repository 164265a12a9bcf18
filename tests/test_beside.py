"""The second process of a first edit on PoCL: it compiles what the edit runs, changes nothing of it, and may fail."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from aw4d import beside
from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import POCL, OpenCLBackend
from aw4d.camera import Camera
from aw4d.gbuffer import PLANES
from aw4d.ingest import ingest_street
from aw4d.io.images import read_rgb
from tests.conftest import ROOT

BROKEN = {
    "cannot start": "1 +",
    "dies": "import os; os.abort()",
    "reads half of its task": "import sys; sys.stdin.buffer.read(1000)",
}
# Stands for work that takes longer than the edit, and says who does it.
ENDLESS = (
    "import os, time, aw4d.beside as b; from pathlib import Path; "
    "b.compile_from_the_end = lambda *task: (Path(r'{pid}').write_text(str(os.getpid())), time.sleep(1000)); b.main()"
)
WAITED_FOR = """
from pathlib import Path
begin = beside.begin
def whole(*task):
    begin(*task).join()
    found = sorted(str(path) for path in Path({pocl!r}).rglob("*.so"))
    Path({found!r}).write_text("\\n".join(found))
beside.begin = whole
"""


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("street") / "street.clip"
    ingest_street(path, frames=2, width=160, height=96, workers=1)
    return path


@pytest.fixture
def on_pocl(opencl_device: OpenCLBackend) -> OpenCLBackend:
    """PoCL, where a second process would help."""
    if opencl_device.report.platform != POCL or len(os.sched_getaffinity(0)) < 2:
        pytest.skip("a driver that compiles side by side, or one core")
    return opencl_device


def _edit(street: Path, weather: str, folder: Path, device: OpenCLBackend, prelude: str = "") -> subprocess.Popen[str]:
    """An edit with nothing on disk that a driver or this project keeps; `prelude` comes before it."""
    (folder / "pocl").mkdir(parents=True)
    out = folder / "out"
    words = ["aw4d", "-q", "edit", str(street), "-w", weather, "-o", str(out), "--device", str(device.report.index)]
    code = f"import sys\nfrom aw4d import beside\nfrom aw4d.cli import main\nsys.argv = {words!r}\n{prelude}\nmain()"
    kept = {"XDG_CACHE_HOME": str(folder), "POCL_CACHE_DIR": str(folder / "pocl")}
    return subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, env=os.environ | kept, stderr=subprocess.PIPE, text=True
    )


def _done(job: subprocess.Popen[str], folder: Path) -> list[bytes]:
    """The pictures of an edit that must have worked."""
    _, said = job.communicate(timeout=120)
    assert job.returncode == 0, said
    assert said == ""
    return [read_rgb(path).tobytes() for path in sorted((folder / "out").iterdir())]


def _compiled(folder: Path) -> set[Path]:
    return {path.relative_to(folder / "pocl") for path in (folder / "pocl").rglob("*.so")}


@pytest.mark.parametrize("weather", ["rain+fog+night", "snow+dusk"])
def test_it_compiles_all_that_the_edit_runs_and_nothing_else(
    street: Path, tmp_path: Path, on_pocl: OpenCLBackend, weather: str
) -> None:
    found = tmp_path / "found"
    waits = WAITED_FOR.format(pocl=str(tmp_path / "pocl"), found=str(found))
    _done(_edit(street, weather, tmp_path, on_pocl, waits), tmp_path)
    of_second = {Path(line).relative_to(tmp_path / "pocl") for line in found.read_text().splitlines()}
    assert len(of_second) > 10
    assert _compiled(tmp_path) == of_second


def test_kernels_and_pictures_are_the_same_with_it_and_without(
    street: Path, tmp_path: Path, on_pocl: OpenCLBackend
) -> None:
    pictures, compiled = [], []
    for name, prelude in {"with": "", **{why: f"beside.CODE = {code!r}" for why, code in BROKEN.items()}}.items():
        folder = tmp_path / name
        pictures.append(_done(_edit(street, "overcast", folder, on_pocl, prelude), folder))
        compiled.append(_compiled(folder))
    assert pictures == pictures[:1] * len(pictures)
    assert compiled == compiled[:1] * len(compiled)


def _ends(pid: int) -> bool:
    """Whether a process is gone within some seconds."""
    for _ in range(100):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("end", ["done", "terminated", "killed"])
def test_it_does_not_outlive_the_edit(street: Path, tmp_path: Path, on_pocl: OpenCLBackend, end: str) -> None:
    pid = tmp_path / "pid"
    job = _edit(street, "fog", tmp_path, on_pocl, f"beside.CODE = {ENDLESS.format(pid=pid)!r}")
    if end == "done":
        _done(job, tmp_path)
        if not pid.exists():
            pytest.skip("the edit was faster than the start of the second process")
    else:
        while not (pid.exists() and pid.read_text()):
            assert job.poll() is None
            time.sleep(0.01)
        (job.terminate if end == "terminated" else job.kill)()
        job.communicate(timeout=60)
    assert _ends(int(pid.read_text()))


# ---- who asks for it -------------------------------------------------------------------------------------------------


def test_it_is_asked_for_once(opencl_device: OpenCLBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    asked = [opencl_device.twin(["fog"], [], (96, 160)) for _ in range(2)]
    helps = opencl_device.report.platform == POCL and len(os.sched_getaffinity(0)) > 1
    assert asked == [(opencl_device.report.index, opencl_device.width) if helps else None, None]


@pytest.mark.parametrize(
    "other", [(["fog", "night_grade"], [], (96, 160)), (["fog"], ["airlight"], (96, 160)), (["fog"], [], (96, 320))]
)
def test_other_kernels_are_asked_for_anew(
    on_pocl: OpenCLBackend,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    other: tuple[list[str], list[str], tuple[int, int]],
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert on_pocl.twin(["fog"], [], (96, 160)) is not None
    assert on_pocl.twin(*other) is not None


def test_where_nothing_can_be_kept_it_is_never_asked_for(
    opencl_device: OpenCLBackend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert opencl_device.twin(["fog"], [], (96, 160)) is None


def test_one_core_and_numpy_need_none(on_pocl: OpenCLBackend, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    assert on_pocl.twin(["fog"], [], (96, 160)) is None
    assert NumpyBackend().twin(["fog"], [], (96, 160)) is None


def test_a_frame_of_nothing_keeps_every_rule() -> None:
    camera = Camera(width=5, height=3, K=np.diag([4.0, 4.0, 1.0]))
    assert set(beside.nothing(list(PLANES), camera)) == set(PLANES)  # GBuffer checks them
