"""KITTI drives: geometry against the recording's own, and what is wrong with a drive told in one line."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.io.images import read_png, write_png
from aw4d.io.kitti import open_kitti

WIDTH, HEIGHT, FIRST, COUNT = 64, 24, 10, 3
DATE = "2011_09_26"
CAM_TO_CAM = f"""calib_time: 09-Jan-2012 13:57:47
S_rect_02: {WIDTH}.0 {HEIGHT}.0
R_rect_00: 1 0 0 0 1 0 0 0 1
P_rect_02: 40 0 31.5 2.4 0 40 8 0 0 0 1 0
"""
VELO_TO_CAM = "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 0\n"  # x ahead, y left, z up
IMU_TO_VELO = "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\n"
LABEL = "{frame} 3 Car 0 0 0.0 0 0 1 1 1.5 1.8 4.0 1.0 1.65 10.0 0.0\n"


def road_scan() -> np.ndarray:
    """Returns of a level road 1.65 m under the scanner, in its frame."""
    x, y = np.meshgrid(np.linspace(4, 40, 60), np.linspace(-10, 10, 41))
    return np.stack([x, y, np.full_like(x, -1.65), np.full_like(x, 0.3)], axis=-1).reshape(-1, 4).astype("<f4")


def make_drive(root: Path, *, oxts: bool = True) -> Path:
    drive = root / DATE / f"{DATE}_drive_0001_sync"
    for folder in ("image_02/data", "velodyne_points/data", "oxts/data"):
        (drive / folder).mkdir(parents=True)
    (drive.parent / "calib_cam_to_cam.txt").write_text(CAM_TO_CAM)
    (drive.parent / "calib_velo_to_cam.txt").write_text(VELO_TO_CAM)
    (drive.parent / "calib_imu_to_velo.txt").write_text(IMU_TO_VELO)
    rng = np.random.default_rng(0)
    for frame in range(FIRST, FIRST + COUNT):
        name = f"{frame:010d}"
        write_png(drive / f"image_02/data/{name}.png", rng.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8))
        road_scan().tofile(drive / f"velodyne_points/data/{name}.bin")
        east = frame * 1.5e-5  # degrees
        (drive / f"oxts/data/{name}.txt").write_text(f"49.0 {8 + east} 110.0 0.0 0.0 0.0 " + "0 " * 24)
    stamps = [f"2011-09-26 13:10:{51 + frame / 10:.9f}" for frame in range(FIRST + COUNT + 5)]
    (drive / "image_02/timestamps.txt").write_text("\n".join(stamps) + "\n")
    (drive / "label_02_0000.txt").write_text(
        "".join(LABEL.format(frame=frame) for frame in range(FIRST, FIRST + COUNT))
        + f"{FIRST} -1 DontCare -1 -1 -10 0 0 1 1 -1000 -1000 -1000 -10 -1 -1 -1\n"
    )
    if not oxts:
        shutil.rmtree(drive / "oxts")
    return drive


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_drive(tmp_path / "Fahrten im Süden")


def test_frames_are_those_of_image_02(drive: Path) -> None:
    source = open_kitti(drive)
    assert len(source.info) == COUNT
    np.testing.assert_allclose(source.info.times, [0, 0.1, 0.2], atol=1e-9)
    assert source.rgb(1).shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_array_equal(source.rgb(1), read_png(drive / f"image_02/data/{FIRST + 1:010d}.png"))


def test_driving_east(drive: Path) -> None:
    """The IMU looks east, level: the camera's z is the world's x, its y the world's down; 1.1 m a frame."""
    info = open_kitti(drive).info
    np.testing.assert_allclose(info.camera_to_world[0][:3, 2], (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(info.camera_to_world[0][:3, 1], (0, -1, 0), atol=1e-12)
    np.testing.assert_array_equal(info.camera_to_world[0][:3, 3], (0, 0, 0))
    metres = 1.5e-5 * np.pi / 180 * 6378137 * np.cos(np.deg2rad(49))
    np.testing.assert_allclose(info.camera_to_world[2][:3, 3], (2 * metres, 0, 0), atol=1e-6)


def test_points_are_in_the_camera_frame(drive: Path) -> None:
    points = open_kitti(drive).points(0)
    assert points is not None
    assert points.dtype == np.float32
    np.testing.assert_allclose(points[:, 1], 1.65, atol=1e-6)  # the road lies below
    np.testing.assert_allclose(points[:, 3], 0.3, atol=1e-6)
    # Camera 2 sits 6 cm left of camera 0: 2.4 / 40 px.
    np.testing.assert_allclose(points[:, 0].mean(), 0.06, atol=1e-5)


def test_boxes(drive: Path) -> None:
    info = open_kitti(drive).info
    assert [len(boxes) for boxes in info.boxes] == [1, 1, 1]
    (box,) = info.boxes[0]
    assert (box.track_id, box.category, box.size) == (3, "Car", (4.0, 1.5, 1.8))
    corners = info.camera(0).to_camera(box.corners())
    # At yaw 0 it lies across the view: 4 m along x, 1.8 m along z, its bottom on the road.
    np.testing.assert_allclose(corners.min(axis=0), (1.06 - 2, 1.65 - 1.5, 10 - 0.9), atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), (1.06 + 2, 1.65, 10 + 0.9), atol=1e-9)


def test_boxes_from_another_file(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text(LABEL.format(frame=FIRST + 1))
    info = open_kitti(drive, labels=tmp_path / "mine.txt").info
    assert [len(boxes) for boxes in info.boxes] == [0, 1, 0]
    assert info.provenance["boxes"] == "mine.txt"


def test_without_oxts_the_camera_is_level_and_still(tmp_path: Path) -> None:
    info = open_kitti(make_drive(tmp_path, oxts=False)).info
    np.testing.assert_array_equal(info.camera_to_world, np.tile(np.diag([1.0, -1, -1, 1]), (COUNT, 1, 1)))
    assert any("still" in sentence for sentence in info.approximations)


def test_without_timestamps_ten_a_second(drive: Path) -> None:
    (drive / "image_02/timestamps.txt").unlink()
    np.testing.assert_allclose(open_kitti(drive).info.times, [0, 0.1, 0.2])


def test_calibration_may_lie_in_the_drive(drive: Path) -> None:
    for path in drive.parent.glob("calib_*.txt"):
        path.rename(drive / path.name)
    assert len(open_kitti(drive).info) == COUNT


def test_nothing_absolute_is_stored(drive: Path) -> None:
    assert str(drive.parent.parent) not in str(open_kitti(drive).info.to_json())


def test_bad_returns_are_dropped(drive: Path) -> None:
    path = drive / f"velodyne_points/data/{FIRST:010d}.bin"
    bad = np.array([[np.nan, 0, 0, 0], [np.inf, 1, 1, 0], [0, 0, 0, 0], [1e30, 0, 0, 1]], "<f4")
    np.concatenate([road_scan(), bad]).tofile(path)
    points = open_kitti(drive).points(0)
    assert points is not None
    assert len(points) == len(road_scan())
    assert np.isfinite(points).all()


def test_fingerprint_follows_the_files(drive: Path) -> None:
    before = open_kitti(drive).fingerprint
    assert open_kitti(drive).fingerprint == before
    write_png(drive / f"image_02/data/{FIRST:010d}.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    assert open_kitti(drive).fingerprint != before


def edit(name: str, old: str, new: str) -> Callable[[Path], None]:
    def apply(drive: Path) -> None:
        path = drive.parent / name
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    return apply


def cut(pattern: str, size: int) -> Callable[[Path], None]:
    def apply(drive: Path) -> None:
        (path,) = drive.glob(pattern)
        path.write_bytes(path.read_bytes()[:size])

    return apply


def remove(pattern: str) -> Callable[[Path], None]:
    def apply(drive: Path) -> None:
        for path in [*drive.glob(pattern), *drive.parent.glob(pattern)]:
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    return apply


def turn_scanner(drive: Path) -> None:
    """All returns behind the camera: another recording's scans."""
    for path in (drive / "velodyne_points/data").iterdir():
        (road_scan() * np.float32([-1, 1, 1, 1])).tofile(path)


def shrink_one_image(drive: Path) -> None:
    write_png(drive / f"image_02/data/{FIRST:010d}.png", np.zeros((HEIGHT, WIDTH - 1, 3), np.uint8))


FAULTS: dict[str, tuple[Callable[[Path], None], str]] = {
    "no images": (remove("image_02"), "image_02"),
    "no scans": (remove("velodyne_points"), "ingest video"),
    "one scan lost": (
        remove(f"velodyne_points/data/*{FIRST + 1}.bin"),
        f"LiDAR does not match .*: {FIRST + 1}; --skip-missing",
    ),
    "truncated scan": (cut(f"velodyne_points/data/*{FIRST + 1}.bin", 1001), rf"{FIRST + 1}\.bin.*truncated"),
    "empty scan": (cut(f"velodyne_points/data/*{FIRST + 1}.bin", 0), rf"{FIRST + 1}\.bin"),
    "scans of another drive": (turn_scanner, f"does not match the image of frame {FIRST}"),
    "no camera calibration": (remove("calib_cam_to_cam.txt"), r"calib_cam_to_cam\.txt"),
    "no scanner calibration": (remove("calib_velo_to_cam.txt"), r"calib_velo_to_cam\.txt"),
    "no IMU calibration": (remove("calib_imu_to_velo.txt"), r"calib_imu_to_velo\.txt"),
    "key lost": (edit("calib_cam_to_cam.txt", "P_rect_02", "P_rect_01"), r"calib_cam_to_cam\.txt.*P_rect_02"),
    "not a number": (edit("calib_cam_to_cam.txt", "31.5", "x"), "P_rect_02.*12 finite numbers"),
    "numbers lost": (edit("calib_velo_to_cam.txt", "0 -1 0 ", ""), r"calib_velo_to_cam\.txt: R: expected 9"),
    "no rotation": (edit("calib_velo_to_cam.txt", "0 -1 0 ", "0 -2 0 "), "expected a rotation"),
    "no focal length": (edit("calib_cam_to_cam.txt", "P_rect_02: 40", "P_rect_02: 0"), "K: expected"),
    "empty calibration": (cut("../calib_cam_to_cam.txt", 0), r"calib_cam_to_cam\.txt: the file is empty"),
    "GPS of one frame lost": (remove(f"oxts/data/*{FIRST + 1}.txt"), f"GPS/IMU does not match .*: {FIRST + 1}$"),
    "GPS corrupt": (cut(f"oxts/data/*{FIRST + 1}.txt", 9), rf"{FIRST + 1}\.txt: expected latitude"),
    "timestamps cut short": (cut("image_02/timestamps.txt", 100), r"timestamps\.txt"),
    "labels cut short": (cut("label_02_0000.txt", 30), r"label_02_0000\.txt: line 1"),
    "labels of words": (edit(f"{DATE}_drive_0001_sync/label_02_0000.txt", "1.65", "low"), "line 1"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_told_when_the_drive_is_opened(drive: Path, fault: str) -> None:
    spoil, message = FAULTS[fault]
    spoil(drive)
    with pytest.raises(InputError, match=message) as caught:
        open_kitti(drive)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (cut(f"image_02/data/*{FIRST}.png", 700), rf"{FIRST}\.png: truncated"),
        (shrink_one_image, f"expected {WIDTH}x{HEIGHT} .*, got {WIDTH - 1}x{HEIGHT}"),
    ],
)
def test_a_faulty_image_is_told_when_it_is_read(drive: Path, spoil: Callable[[Path], None], message: str) -> None:
    spoil(drive)
    source = open_kitti(drive)
    source.rgb(1)
    with pytest.raises(InputError, match=message):
        source.rgb(0)


@pytest.mark.parametrize("name", ["nowhere", "empty", "file"])
def test_not_a_drive(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="KITTI raw drive"):
        open_kitti(tmp_path / name)


def test_frames_without_a_scan_can_be_left_out(drive: Path) -> None:
    remove(f"velodyne_points/data/*{FIRST + 1}.bin")(drive)
    source = open_kitti(drive, skip_missing=True)
    assert len(source.info) == COUNT - 1
    assert source.points(1) is not None


@pytest.mark.clip
def test_poses_agree_with_the_recordings_own(kitti_drive: Path) -> None:
    """Relative to the first frame, which no choice of world changes."""
    table = np.loadtxt(kitti_drive / "poses_cam2_to_world.txt")
    given = np.tile(np.eye(4), (len(table), 1, 1))
    given[:, :3] = table[:, 1:].reshape(-1, 3, 4)
    given = given[FIRST : FIRST + 57]
    ours = open_kitti(kitti_drive).info.camera_to_world
    relative, expected = np.linalg.inv(ours[0]) @ ours, np.linalg.inv(given[0]) @ given
    np.testing.assert_allclose(relative[:, :3, 3], expected[:, :3, 3], atol=1e-3)
    np.testing.assert_allclose(relative[:, :3, :3], expected[:, :3, :3], atol=1e-4)


@pytest.mark.clip
def test_up_is_up_and_the_axes_are_the_recordings(kitti_drive: Path) -> None:
    """Ours is x east, y up, z south; the other world is turned about the vertical and has z up."""
    table = np.loadtxt(kitti_drive / "poses_cam2_to_world.txt")[FIRST : FIRST + 57, 1:].reshape(-1, 3, 4)
    ours = open_kitti(kitti_drive).info.camera_to_world
    # Its world is the first frame's IMU frame, which pitches and rolls by a degree on the road.
    np.testing.assert_allclose(ours[:, 1, :3], table[:, 2, :3], atol=0.02)
    assert np.linalg.det(ours[:, :3, :3]) == pytest.approx(1)


@pytest.mark.clip
def test_scans_lie_on_the_road_and_in_the_boxes(kitti_drive: Path) -> None:
    source = open_kitti(kitti_drive)
    for index in (0, 28, 56):
        points, camera = source.points(index), source.info.camera(index)
        assert points is not None
        world = camera.to_world(points[:, :3])
        ahead = (np.abs(points[:, 0]) < 2) & (points[:, 2] < 15) & (points[:, 1] > 0.5)
        assert np.median(world[ahead, 1] - camera.camera_to_world[1, 3]) == pytest.approx(-1.65, abs=0.1)
        near = [
            b
            for b in source.info.boxes[index]
            if np.linalg.norm(b.object_to_world[:3, 3] - camera.camera_to_world[:3, 3]) < 20
        ]
        assert near
        for box in near:
            assert np.count_nonzero(box.contains(world)) > 50
