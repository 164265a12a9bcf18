"""Videos come back as they were written, within H.264's loss, and appear whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.io.horizon import find_horizon, level_pose
from aw4d.io.video import VideoWriter, open_video, read_video

FRAMES = 12


def patches(height: int, width: int, index: int = 0) -> np.ndarray:
    """Broad patches of colour that H.264 and 4:2:0 keep, and a bar that moves by two pixels a frame."""
    colours = np.array([(200, 40, 30), (20, 120, 220), (90, 160, 60), (128, 128, 128), (250, 250, 250), (5, 5, 5)])
    image = colours[np.arange(width) * len(colours) // width]
    image = np.broadcast_to(image, (height, width, 3)).copy()
    image[:, 2 * index : 2 * index + 2] = 255
    return image.astype(np.uint8)


def write(path: Path, *, height: int = 64, width: int = 96, frames: int = FRAMES) -> Path:
    with VideoWriter(path, fps=10) as writer:
        for index in range(frames):
            writer.write(patches(height, width, index))
    return path


@pytest.mark.parametrize("name", ["a.mp4", "ä b 東.mp4", "a.mkv"])
def test_round_trip(tmp_path: Path, name: str) -> None:
    read = list(read_video(write(tmp_path / name)))
    assert len(read) == FRAMES
    for index in (0, FRAMES - 1):
        middles = np.s_[32, 40::16]  # away from edges, where chroma is shared
        difference = np.abs(read[index][middles].astype(int) - patches(64, 96, index)[middles])
        assert difference.max() <= 6  # BT.601 instead of BT.709 would be 20 off in red and green
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_tags(tmp_path: Path) -> None:
    with av.open(str(write(tmp_path / "a.mp4"))) as container:
        stream = container.streams.video[0]
        context = stream.codec_context
        assert (context.name, context.pix_fmt) == ("h264", "yuv420p")
        assert (context.colorspace, context.color_primaries, context.color_trc, context.color_range) == (1, 1, 1, 1)
        assert stream.average_rate == 10
        assert stream.frames == FRAMES


@pytest.mark.parametrize(("height", "width"), [(63, 95), (64, 95), (63, 96), (17, 33)])
def test_odd_sizes_continue_the_edge(tmp_path: Path, height: int, width: int) -> None:
    picture = next(read_video(write(tmp_path / "a.mp4", height=height, width=width, frames=2)))
    assert picture.shape == (height + height % 2, width + width % 2, 3)
    np.testing.assert_allclose(picture[-1, 4:].astype(int), picture[-2, 4:], atol=6)
    np.testing.assert_allclose(picture[:, -1].astype(int), picture[:, -2], atol=6)


def test_an_error_inside_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with VideoWriter(tmp_path / "a.mp4", fps=10) as writer:
            writer.write(patches(64, 96))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not list(tmp_path.iterdir())


def test_an_old_video_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4")
    before = path.read_bytes()
    with VideoWriter(path, fps=10) as writer:
        writer.write(patches(32, 48))
        assert path.read_bytes() == before
    assert path.read_bytes() != before


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((64, 98, 3), np.uint8), r"expected a picture \(64, 96, 3\)"),
        (np.zeros((64, 96, 3), np.float32), "float32"),
        (np.zeros((64, 96), np.uint8), "expected a picture"),
    ],
)
def test_other_pictures_are_refused(tmp_path: Path, picture: np.ndarray, message: str) -> None:
    def mixed() -> None:
        with VideoWriter(tmp_path / "a.mp4", fps=10) as writer:
            writer.write(patches(64, 96))
            writer.write(picture)

    with pytest.raises(InputError, match=message):
        mixed()
    assert not list(tmp_path.iterdir())


def test_no_picture(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one picture"), VideoWriter(tmp_path / "a.mp4", fps=10):
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["nowhere/a.mp4", "file/a.mp4", "a.gifv", "a"])
def test_unwritable(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match=r"cannot be written|ending in"):
        write(tmp_path / name)


FULL_DISK = """
import resource, signal, sys
import numpy as np
from aw4d.errors import InputError
from aw4d.io.video import VideoWriter
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
rng = np.random.default_rng(0)
try:
    with VideoWriter(sys.argv[1], fps=10) as writer:
        for _ in range(60):
            writer.write(rng.integers(0, 255, (128, 128, 3), dtype=np.uint8))
except InputError as error:
    print(error)
"""


def test_full_disk(tmp_path: Path) -> None:
    """A limit on the file's size stands for a full disk."""
    job = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path / "a.mp4")], capture_output=True, text=True, check=True
    )
    assert "a.mp4: cannot be written" in job.stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 0.9])
def test_truncated(tmp_path: Path, kept: float) -> None:
    path = write(tmp_path / "a.mp4", frames=40)
    path.write_bytes(path.read_bytes()[: int(kept * path.stat().st_size)])
    with pytest.raises(InputError, match=r"a\.mp4"):
        list(read_video(path))
    with pytest.raises(InputError, match=r"a\.mp4"):
        open_video(path)


def test_truncated_says_how_far_it_came(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4", frames=40)
    path.write_bytes(path.read_bytes()[: int(0.9 * path.stat().st_size)])
    with pytest.raises(InputError, match=r"(after|got) \d+"):
        open_video(path)


@pytest.mark.parametrize("name", ["nowhere.mp4", "folder", "text.mp4"])
def test_no_video(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.mp4").write_text("hello")
    with pytest.raises(InputError, match="expected a"):
        open_video(tmp_path / name)


@pytest.mark.parametrize("options", [{"camera_height_m": 0}, {"camera_height_m": -1}, {"fov_deg": 0}, {"fov_deg": 180}])
def test_options_out_of_range(tmp_path: Path, options: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(options))):
        open_video(write(tmp_path / "a.mp4"), **options)


def test_frames_by_number(tmp_path: Path) -> None:
    path = write(tmp_path / "a.mp4")
    source, expected = open_video(path), list(read_video(path))
    assert len(source.info) == FRAMES
    np.testing.assert_allclose(source.info.times, np.arange(FRAMES) / 10, atol=1e-9)
    for index in (0, 1, 2, 7, 3, 3, 11, 0):
        np.testing.assert_array_equal(source.rgb(index), expected[index])


def test_horizon_of_drawn_lanes() -> None:
    """Straight lines on a level road meet on the horizon."""
    import cv2

    picture = np.full((540, 960, 3), 90, np.uint8)
    for foot in (-600, 100, 420, 860, 1500):
        cv2.line(picture, (foot, 539), (470, 300), (240, 240, 240), 4)
    picture[:310] = 90
    horizon, shape = find_horizon([picture])
    assert shape == (540, 960)
    assert horizon.votes == 1
    assert horizon.row == pytest.approx(300, abs=4)


def test_no_lines_no_horizon() -> None:
    horizon, _ = find_horizon([np.full((100, 200, 3), 90, np.uint8)])
    assert (horizon.row, horizon.votes) == (49.5, 0)


@pytest.mark.parametrize("row", [100.0, 269.5, 400.0])
def test_level_pose_puts_the_horizon_in_its_row(row: float) -> None:
    K = np.array([[800.0, 0, 479.5], [0, 800, 269.5], [0, 0, 1]])
    pose = level_pose(row, K)
    ray = pose[:3, :3] @ np.linalg.solve(K, (123.0, row, 1.0))
    assert ray[1] == pytest.approx(0, abs=1e-12)
    assert (pose[:3, :3] @ (0, -1, 0))[1] > 0
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)


@pytest.mark.clip
def test_highway(test_data: Path) -> None:
    """The lanes of this clip meet at row 305 to 320, found by hand in three pictures."""
    source = open_video(test_data / "carnd_p1" / "solidWhiteRight.mp4")
    assert len(source.info) == 221
    assert source.info.fps == pytest.approx(25)
    camera = source.info.camera(0)
    forward = camera.world_to_camera[:3, :3] @ (0, 0, -1)
    assert 300 < camera.project(forward)[1] < 325
