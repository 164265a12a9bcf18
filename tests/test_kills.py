"""An edit or an ingest that is killed at any moment: the old target is whole, or the new one; the next run completes.

The moments are drawn from a seed, over the time that an undisturbed run takes. `AW4D_KILLS` sets how many of each kind.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.ingest import ingest_street
from aw4d.io.images import read_rgb, write_png
from aw4d.io.video import read_video
from tests.conftest import ROOT

KILLS = int(os.environ.get("AW4D_KILLS", "8"))
Pictures = NDArray[np.uint8]
SIZE = (24, 40)  # rows, columns [px]


def _start(*words: object) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "aw4d.cli", "--quiet", *map(str, words)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


def _run(*words: object) -> float:
    """Run a command to its end; the seconds that it took."""
    start = time.perf_counter()
    job = _start(*words)
    _, err = job.communicate(timeout=120)
    assert job.returncode == 0, err.decode()
    return time.perf_counter() - start


def _kill(after_s: float, *words: object) -> None:
    job = _start(*words)
    try:
        job.wait(timeout=after_s)
    except subprocess.TimeoutExpired:
        job.send_signal(signal.SIGKILL)
    job.communicate(timeout=60)


def _pictures(path: Path) -> Pictures:
    """All pictures of a video or of a folder, (N, H, W, 3)."""
    return np.stack(list(read_video(path)) if path.is_file() else [read_rgb(file) for file in sorted(path.iterdir())])


def _same(a: Pictures, b: Pictures) -> bool:
    """Whether they are of one edit. Two runs' pictures are equal to the bit; x264 makes not quite the same of them."""
    return a.shape == b.shape and float(np.abs(a.astype(np.int16) - b).mean()) < 1


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("street") / "street.clip"
    ingest_street(path, frames=6, width=160, height=96, workers=1)
    return path


@pytest.mark.parametrize("name", ["out.mp4", "out"])
def test_a_killed_edit(street: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    old_edit = ("edit", street, "-w", "overcast", "-o", out, "--overwrite")
    edit = ("edit", street, "-w", "fog", "-o", out, "--overwrite")
    _run(*old_edit)
    old = _pictures(out)
    took_s = min(_run(*edit) for _ in range(2))
    new = _pictures(out)
    assert not _same(new, old)
    rng, ends = np.random.default_rng(1), set()
    for _ in range(-(-KILLS // 2)):
        _run(*old_edit)
        _kill(rng.uniform(0, 1.05) * took_s, *edit)
        found = _pictures(out)
        assert _same(found, old) or _same(found, new)
        ends.add(_same(found, new))
        _run(*edit)
        assert _same(_pictures(out), new)
        json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([name, "out.json"])
    assert False in ends  # at least one was killed before its end


def _recording(folder: Path, shade: int) -> Path:
    """Pictures and depths of six frames."""
    rng = np.random.default_rng(shade)
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
    for index in range(6):
        write_png(folder / "rgb" / f"{index}.png", rng.integers(shade, shade + 50, (*SIZE, 3), dtype=np.uint8))
        write_png(folder / "depth" / f"{index}.png", rng.integers(2000, 9000, SIZE, dtype=np.uint16))
    return folder


def _planes(path: Path) -> list[dict[str, bytes]]:
    clip = Clip(path)
    return [{name: clip.frame(index)[name].tobytes() for name in clip.planes} for index in range(len(clip))]


def test_a_killed_ingest(tmp_path: Path) -> None:
    first, second = (_recording(tmp_path / f"recording{shade}", shade) for shade in (20, 120))
    out = tmp_path / "a.clip"
    words = [("ingest", "frames", of, "--fov-deg", 70, "-o", out, "--overwrite") for of in (first, second)]
    _run(*words[0])
    old = _planes(out)
    took_s = _run(*words[1])
    new = _planes(out)
    assert new != old
    rng = np.random.default_rng(2)
    for number in range(KILLS):
        _run(*words[0])
        _kill(rng.uniform(0, 1.05) * took_s, *words[1])
        assert _planes(out) in (old, new), f"kill {number}"
        _run(*words[1])
        assert _planes(out) == new, f"kill {number}"
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.clip", "recording120", "recording20"]
