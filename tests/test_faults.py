"""What goes wrong outside of an edit: a lost device, no memory, a signal; told in one line, nothing half-written."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.clip import SUFFIX_PARTIAL, Clip
from aw4d.errors import InputError, JobError
from aw4d.exchange import put
from aw4d.ingest import ingest_street
from aw4d.io.files import remove_left, replacing
from aw4d.output import write_edit
from aw4d.pipeline import plan
from aw4d.pool import ordered_map

ROOT = Path(__file__).resolve().parent.parent
FRAMES, WIDTH, HEIGHT = 3, 64, 36


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    path = tmp_path_factory.mktemp("street") / "street.aw4d"
    return ingest_street(path, frames=FRAMES, width=WIDTH, height=HEIGHT, workers=1)


# ---- the device --------------------------------------------------------------------------------------------------


class Failing:
    """pyopencl, whose calls to a device raise from the n-th one on."""

    def __init__(self, cl: ModuleType, error: Exception, after: int) -> None:
        self._cl, self._error, self._left = cl, error, after

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._cl, name)
        return self._counted(found) if name.startswith("enqueue_") else found

    def _counted(self, call: Any) -> Any:
        def counted(*args: Any, **kwargs: Any) -> Any:
            self._left -= 1
            if self._left < 0:
                raise self._error
            return call(*args, **kwargs)

        return counted


@pytest.fixture
def lost(opencl_device: OpenCLBackend, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Makes the device fail after so many calls."""

    def fail(error: Exception, after: int) -> OpenCLBackend:
        broken = Failing(opencl.load(), error, after)
        backend = OpenCLBackend(opencl_device.report.index)
        monkeypatch.setattr(backend, "_cl", broken)
        return backend

    return fail


def _lost_error() -> Exception:
    cl = opencl.load()
    error: Exception = cl.RuntimeError("clEnqueueNDRangeKernel failed: DEVICE_NOT_AVAILABLE")
    return error


@pytest.mark.parametrize("after", [0, 3, 11, 40, 75])
@pytest.mark.parametrize("name", ["out.mp4", "out"])
def test_a_device_lost_in_mid_run(clip: Clip, lost: Any, tmp_path: Path, name: str, after: int) -> None:
    backend = lost(_lost_error(), after)
    with pytest.raises(JobError, match=r"lost.*DEVICE_NOT_AVAILABLE.*--device.*--backend numpy") as told:
        write_edit(clip, plan(clip, "snow+fog", ()), backend, range(FRAMES), tmp_path / name)
    assert backend.report.name in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_a_device_that_fails_while_waited_for(opencl_device: OpenCLBackend, monkeypatch: pytest.MonkeyPatch) -> None:
    class Queue:
        def finish(self) -> None:
            raise _lost_error()

    monkeypatch.setattr(opencl_device, "_queue", Queue())
    with pytest.raises(JobError, match="lost"):
        opencl_device.finish()


def test_memory_that_ends_at_the_first_use(clip: Clip, lost: Any, tmp_path: Path) -> None:
    """Some runtimes take memory when a buffer is first written, not when it is made."""
    cl = opencl.load()
    backend = lost(cl.MemoryError("clEnqueueWriteBuffer failed: MEM_OBJECT_ALLOCATION_FAILURE"), 5)
    with pytest.raises(JobError, match=r"out of memory.*MB.*smaller frames"):
        write_edit(clip, plan(clip, "fog", ()), backend, range(FRAMES), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_buffer_that_is_too_large(opencl_device: OpenCLBackend) -> None:
    """A real one: more than any device has."""
    with pytest.raises(JobError, match=r"no 1125899907 MB for depth.*MB in use.*smaller frames.*--backend numpy"):
        opencl_device._buffer("depth", 2**50)


def test_the_command_line_ends_with_1(
    clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from aw4d import cli, render

    def fail(*_: object) -> None:
        raise JobError("the device failed or was lost (DEVICE_NOT_AVAILABLE);\n try again")

    monkeypatch.setattr(render, "open_backend", fail)
    words = ["aw4d", "edit", str(clip.path), "-w", "fog", "-o", str(tmp_path / "out.mp4")]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    assert capsys.readouterr().err == "aw4d: the device failed or was lost (DEVICE_NOT_AVAILABLE); try again\n"


# ---- processes ---------------------------------------------------------------------------------------------------


def _die(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_worker_that_is_killed() -> None:
    with pytest.raises(JobError, match="killed"):
        list(ordered_map(_die, range(6), workers=2))


def _die_sending(number: int) -> tuple[int, bytes]:
    """More than a pipe holds, so that the writer of an answer that nobody reads yet is in the middle of it."""
    if number == 1:
        threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return number, bytes(1 << 24)


def test_a_worker_that_is_killed_while_it_answers() -> None:
    """Half a result is no result, and nobody waits for the other half."""
    results = ordered_map(_die_sending, range(6), workers=2)
    assert next(results)[0] == 0
    time.sleep(2)  # the other worker fills its pipe and dies
    with pytest.raises(JobError, match="killed"):
        list(results)


def test_what_fails_in_a_worker_fails_here() -> None:
    with pytest.raises(ZeroDivisionError):
        list(ordered_map((12).__floordiv__, [3, 2, 0, 1], workers=2))


def _dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_leftovers_of_dead_processes_go_and_those_of_living_ones_stay(tmp_path: Path) -> None:
    host = os.uname().nodename
    dead, alive = (tmp_path / f".out.{host}.{process}.tmp" for process in (_dead_process(), os.getppid()))
    others = [tmp_path / f".out.elsewhere.{_dead_process()}.tmp", tmp_path / f".out2.{host}.{_dead_process()}.tmp"]
    for folder in (dead, alive, *others):
        folder.mkdir()
        (folder / "000000.png").write_bytes(b"half")
    file = tmp_path / f".out.{host}.{_dead_process()}.tmp"
    file.write_bytes(b"half")
    remove_left(tmp_path / "out")
    assert sorted(tmp_path.iterdir()) == sorted([alive, *others])


def test_names_that_glob_would_read_otherwise(tmp_path: Path) -> None:
    left = tmp_path / f".out[1].{os.uname().nodename}.{_dead_process()}.tmp"
    left.touch()
    remove_left(tmp_path / "out[1]")
    assert not left.exists()


@pytest.mark.parametrize("exchange", [True, False])
def test_a_folder_takes_the_place_of_another(tmp_path: Path, exchange: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not exchange:  # as a file system answers that has none
        monkeypatch.setattr("aw4d.exchange.exchanged", lambda *_: False)
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    put(tmp_path / "new", tmp_path / "old")
    assert [path.name for path in (tmp_path / "old").iterdir()] == ["new"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["old"]


def test_an_edit_into_a_read_only_place(clip: Clip) -> None:
    """The kernel's own files refuse even root."""
    with pytest.raises(InputError, match=r"^/proc/out: cannot be written"):
        write_edit(clip, plan(clip, "fog", ()), OpenCLBackend(), range(FRAMES), Path("/proc/out"))
    with (
        pytest.raises(InputError, match=r"^/proc/out\.json: cannot be written"),
        replacing(Path("/proc/out.json")) as f,
    ):
        f.touch()


# ---- signals -----------------------------------------------------------------------------------------------------


def _start(*words: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "aw4d.cli", *map(str, words)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _wait_for(folder: Path, pattern: str) -> None:
    end = time.monotonic() + 60
    while not any(folder.glob(pattern)):
        assert time.monotonic() < end, f"{pattern} never came: {list(folder.rglob('*'))}"
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_edit_leaves_the_old_one(tmp_path: Path, number: signal.Signals) -> None:
    """In the middle of a frame, which on NumPy takes seconds at this size."""
    ingest_street(tmp_path / "clip", frames=2, width=960, height=528, workers=1)
    out = tmp_path / "out"
    out.mkdir()
    job = _start("edit", tmp_path / "clip", "-w", "fog", "--backend", "numpy", "-o", out)
    _wait_for(tmp_path, ".out.*.tmp")
    job.send_signal(number)
    _, err = job.communicate(timeout=60)
    assert job.returncode == 1
    assert err.splitlines()[-1] == f"aw4d: stopped by {number.name}; nothing half-written is left behind"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip", "out"]
    assert list(out.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_ingest_goes_on(tmp_path: Path, number: signal.Signals) -> None:
    out = tmp_path / "street_960x528_8.aw4d"
    words = ("demo", "-o", tmp_path, "--frames", 8, "--width", 960, "--height", 528)
    job = _start(*words)
    _wait_for(tmp_path, f"{out.name}{SUFFIX_PARTIAL}/done/*")
    job.send_signal(number)
    _, err = job.communicate(timeout=60)
    assert job.returncode == 1
    *_, hint, last = err.splitlines()
    assert hint == "the same command goes on where this one is stopped"
    assert last == f"aw4d: stopped by {number.name}; nothing half-written is left behind"
    assert [path.name for path in tmp_path.iterdir()] == [out.name + SUFFIX_PARTIAL]
