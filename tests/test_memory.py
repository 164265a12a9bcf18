"""Memory of an edit does not grow with the clip's length."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aw4d.clip import ClipInfo, ClipWriter
from aw4d.gbuffer import GBuffer
from tests.made_up import camera, picture, planes

WIDTH, HEIGHT = 320, 176
MEASURE = """
import resource, sys
from aw4d.cli import main
sys.argv = ["aw4d", "--quiet", "edit", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def _clip(path: Path, frames: int) -> Path:
    from aw4d.colour import decode_srgb8

    view = camera(WIDTH, HEIGHT)
    held = {"rgb": decode_srgb8(picture(WIDTH, HEIGHT)), **planes(WIDTH, HEIGHT, 0)}
    with ClipWriter(path, (frames, HEIGHT, WIDTH), fingerprint="made up") as writer:
        for i in range(frames):
            writer.write(i, GBuffer(held, camera=view, time=i / 10))
        info = ClipInfo(
            name="made up",
            width=WIDTH,
            height=HEIGHT,
            K=np.broadcast_to(view.K, (frames, 3, 3)).copy(),
            camera_to_world=np.broadcast_to(view.camera_to_world, (frames, 4, 4)).copy(),
            times=np.arange(frames) / 10,
        )
        writer.finish(info)
    return path


def _peak_kb(clip: Path, out: Path) -> int:
    command = [sys.executable, "-c", MEASURE, str(clip), "--weather", "fog", "-o", str(out)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()[-1])


@pytest.mark.timeout(600)
def test_ten_times_the_frames_take_the_same_memory(tmp_path: Path) -> None:
    short, long = (_peak_kb(_clip(tmp_path / str(n), n), tmp_path / f"{n}.mp4") for n in (57, 570))
    assert long < 1.05 * short
