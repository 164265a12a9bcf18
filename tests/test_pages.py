"""Memory for planes in large pages."""

import subprocess
import sys

import numpy as np
import pytest

from aw4d import pages
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.against import scenes
from aw4d.bench.frames import street_frame
from aw4d.opencl import devices


@pytest.mark.parametrize("nbytes", [1, 64, 4097, 3 * pages.LARGE + 1])
def test_memory_is_as_large_as_asked_whole_lines_and_zeros(nbytes: int) -> None:
    memory = pages.in_large_pages(nbytes)
    assert nbytes <= memory.nbytes < nbytes + pages.LINE
    assert memory.nbytes % pages.LINE == 0
    assert memory.ctypes.data % pages.STEP == 0
    assert not memory.any()
    memory[:] = 1  # all of it is there


def test_blocks_one_after_the_other_begin_at_different_sets_of_a_cache() -> None:
    starts = {pages.in_large_pages(pages.LARGE).ctypes.data % pages.LARGE for _ in range(pages.STEPS)}
    assert len(starts) == pages.STEPS


def test_more_than_there_is_is_told() -> None:
    with pytest.raises(OSError, match="memory"):
        pages.in_large_pages(1 << 60)


@pytest.mark.parametrize("index", [0, 1])
def test_work_is_done_before_its_planes_go(index: int) -> None:
    """In a process of its own: one that is wrong ends by a signal."""
    code = f"""
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.against import PARAMS, scenes
from aw4d.bench.frames import street_frame
frame = street_frame(1280, 704)
for _ in range(3):
    backend = OpenCLBackend({index})
    planes = backend.upload(frame, scenes(frame)["everywhere"])
    for _ in range(9):
        backend.run("fog", planes, PARAMS["fog"])
    del backend, planes
"""
    if index >= len(devices()):
        pytest.skip("there is one device")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_is_kept_of_a_plane_is_the_frame_not_the_room_of_a_larger_one() -> None:
    backend = OpenCLBackend()
    for size in ((96, 64), (32, 16)):
        frame = street_frame(*size)
        planes = backend.upload(frame, scenes(frame)["street"])
    kept = backend.keep(planes, ["albedo", "sky"])
    assert {name: buffer.size for name, buffer in kept.items()} == {"albedo": 12 * planes.plane, "sky": planes.plane}
    backend.put(planes, "albedo", np.zeros((16, 32, 3), np.float32))
    backend.restore(planes, kept)
    np.testing.assert_array_equal(backend.download(planes, ["albedo"])["albedo"], frame["albedo"])
