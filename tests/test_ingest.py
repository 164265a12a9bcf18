"""An ingest gives the planes of the recording, survives its own death, and leaves nothing behind a faulty recording."""

from __future__ import annotations

import dataclasses
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from aw4d import street
from aw4d.clip import SUFFIX_PARTIAL, Clip
from aw4d.colour import encode_srgb8
from aw4d.errors import InputError
from aw4d.extract.visibility import visible_uvz
from aw4d.gbuffer import PLANES
from aw4d.ingest import ingest, ingest_street
from aw4d.io.kitti import open_kitti
from aw4d.io.source import Source
from aw4d.io.video import VideoWriter, open_video
from aw4d.pool import ordered_map
from tests import made_up

FRAMES, WIDTH, HEIGHT = 5, 48, 32


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    return ingest(made_up.source(FRAMES), tmp_path_factory.mktemp("whole ä") / "clip", workers=1)


def test_given_planes_are_kept(whole: Clip) -> None:
    for index in range(FRAMES):
        frame, given = whole.frame(index), made_up.planes(WIDTH, HEIGHT, index)
        assert set(frame) == {*given, "rgb", "emissive", "street_light"}
        sky = given["sky"]
        np.testing.assert_array_equal(frame["depth"][~sky], given["depth"][~sky])
        np.testing.assert_allclose(frame["normal"], given["normal"], atol=2.5e-5)
        np.testing.assert_array_equal(frame["road"], given["road"])
        np.testing.assert_array_equal(whole.points(index), made_up.points(WIDTH, HEIGHT))


def test_sky_gets_the_percentile_of_the_whole_clip(whole: Clip) -> None:
    sky = made_up.sky(WIDTH, HEIGHT)
    depth = np.concatenate([made_up.planes(WIDTH, HEIGHT, index)["depth"][~sky] for index in range(FRAMES)])
    assert whole.info.sky_depth_m == pytest.approx(np.percentile(depth, 99), rel=2e-3)
    for index in range(FRAMES):
        assert (whole.frame(index)["depth"][sky] == np.float32(whole.info.sky_depth_m)).all()


def test_environment_is_the_mean_radiance(whole: Clip) -> None:
    sky = made_up.sky(WIDTH, HEIGHT)
    rgb = np.stack([whole.frame(index)["rgb"].astype(np.float64) for index in range(FRAMES)])
    np.testing.assert_allclose(whole.info.environment["sky"], rgb[:, sky].mean(axis=(0, 1)), rtol=1e-9)
    np.testing.assert_allclose(whole.info.environment["ground"], rgb[:, ~sky].mean(axis=(0, 1)), rtol=1e-9)


def test_number_of_workers_changes_nothing(whole: Clip, tmp_path: Path) -> None:
    ingest(made_up.source(FRAMES), tmp_path / "clip", workers=2)
    assert files(tmp_path / "clip") == files(whole.path)


def test_progress(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    ingest(made_up.source(3), tmp_path / "clip", workers=1, progress=lambda *step: seen.append(step))
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]


# Kills itself without warning, after so many frames or in the second pass.
KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
from tests import made_up
from aw4d import ingest as job
from aw4d.clip import ClipWriter

out, place, workers = sys.argv[2], sys.argv[3], int(sys.argv[4])
def die():
    import multiprocessing
    print(*(child.pid for child in multiprocessing.active_children()), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
def progress(done, total):
    if place.isdigit() and done == int(place):
        die()
rewrite, calls = ClipWriter.rewrite, []
def rewriting(self, *arguments):
    rewrite(self, *arguments)
    calls.append(1)
    if len(calls) == 2:
        die()
if place == "second pass":
    ClipWriter.rewrite = rewriting
job.ingest(made_up.source(5), out, workers=workers, progress=progress)
"""


def run_killed(out: Path, place: str, workers: int = 1) -> list[int]:
    """Process ids of the workers at the moment of death."""
    job = subprocess.run(
        [sys.executable, "-c", KILLED, str(Path(__file__).parent.parent), str(out), place, str(workers)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert job.returncode == -signal.SIGKILL, job.stderr
    return [int(number) for number in job.stdout.split()]


@pytest.mark.parametrize("place", ["0", "1", "3", "5", "second pass"])
def test_killed_then_resumed_is_equal_to_uninterrupted(whole: Clip, tmp_path: Path, place: str) -> None:
    out = tmp_path / "clip"
    run_killed(out, place)
    assert not out.exists()
    for folder in [path for path in tmp_path.rglob("*") if path.is_dir()]:
        with pytest.raises(InputError):
            Clip(folder)
    done = {"second pass": 5}.get(place) or int(place)
    steps: list[int] = []
    ingest(made_up.source(FRAMES), out, workers=1, progress=lambda done, total: steps.append(done))
    assert steps[0] == done
    assert files(out) == files(whole.path)
    assert [path.name for path in tmp_path.iterdir()] == ["clip"]


def test_workers_die_with_their_parent(tmp_path: Path) -> None:
    children = run_killed(tmp_path / "clip", "1", workers=2)
    assert len(children) == 2
    patience = time.monotonic() + 60

    def alive(number: int) -> bool:
        try:
            return "Z" not in Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return False

    while any(alive(number) for number in children) and time.monotonic() < patience:
        time.sleep(0.1)
    assert not any(alive(number) for number in children)


def faulty(kind: str) -> Source:
    source = made_up.source(FRAMES)

    def rgb(index: int) -> np.ndarray:
        if index == 3:
            raise InputError("0003.png: truncated PNG")
        return source.rgb(index)

    def planes(index: int) -> dict[str, np.ndarray]:
        given = source.planes(index)
        if index == 3:
            given["depth"][4, 4] = {"nan": np.nan, "negative": -1.0, "zero": 0.0, "inf": np.inf}[kind]
        return given

    return dataclasses.replace(source, **({"rgb": rgb} if kind == "unreadable" else {"planes": planes}))


@pytest.mark.parametrize("kind", ["unreadable", "nan", "negative", "zero", "inf"])
@pytest.mark.parametrize("workers", [1, 2])
def test_a_faulty_frame_is_named_and_nothing_is_left(tmp_path: Path, kind: str, workers: int) -> None:
    with pytest.raises(InputError, match=r"0003\.png" if kind == "unreadable" else "frame 3: depth") as caught:
        ingest(faulty(kind), tmp_path / "clip", workers=workers)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_faulty_recording_does_not_touch_the_old_clip(tmp_path: Path) -> None:
    ingest(made_up.source(2), tmp_path / "clip", workers=1)
    with pytest.raises(InputError):
        ingest(faulty("nan"), tmp_path / "clip", workers=1, overwrite=True)
    assert len(Clip(tmp_path / "clip")) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["clip"]


FULL_DISK = """
import resource, signal, sys
sys.path.insert(0, sys.argv[1])
from tests import made_up
from aw4d.errors import InputError
from aw4d.ingest import ingest
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
def progress(done, total):
    if done == 2:
        resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300))
try:
    ingest(made_up.source(5), sys.argv[2], workers=1, progress=progress)
except InputError as error:
    print(error)
"""


def test_full_disk_then_resumed(whole: Clip, tmp_path: Path) -> None:
    """A limit on the size of files stands for a full disk."""
    out = tmp_path / "clip"
    command = [sys.executable, "-c", FULL_DISK, str(Path(__file__).parent.parent), str(out)]
    job = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "frame 2 cannot be written" in job.stdout
    assert [path.name for path in tmp_path.iterdir()] == [f"clip{SUFFIX_PARTIAL}"]
    steps: list[int] = []
    ingest(made_up.source(FRAMES), out, workers=1, progress=lambda done, total: steps.append(done))
    assert steps[0] == 2
    assert files(out) == files(whole.path)


def test_memory_does_not_grow_with_length(tmp_path: Path) -> None:
    width, height = 128, 96

    def peak(frames: int) -> int:
        tracemalloc.start()
        ingest(made_up.source(frames, width, height), tmp_path / f"{frames}", workers=1)
        highest = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return highest

    peak(2)  # what is imported and cached once
    one_frame = sum(plane.nbytes for plane in made_up.planes(width, height, 0).values())
    assert peak(30) - peak(5) < one_frame


def relative(source: Source, scale: float, bias: float) -> Source:
    def planes(index: int) -> dict[str, np.ndarray]:
        given = made_up.planes(WIDTH, HEIGHT, 0)
        given["depth"] = ((made_up.road_depth(WIDTH, HEIGHT) - bias) / scale).astype(np.float32)
        return given

    return dataclasses.replace(source, planes=planes, relative_depth=True)


def test_relative_depth_is_aligned_with_the_returns(tmp_path: Path) -> None:
    clip = ingest(relative(made_up.source(3), 37.0, 0.4), tmp_path / "clip", workers=1)
    seen = ~made_up.sky(WIDTH, HEIGHT)
    np.testing.assert_allclose(clip.frame(1)["depth"][seen], made_up.road_depth(WIDTH, HEIGHT)[seen], rtol=1e-4)
    assert "scale 37" in clip.info.provenance["depth"]


def test_relative_depth_is_scaled_by_the_cameras_height(tmp_path: Path) -> None:
    source = dataclasses.replace(
        relative(made_up.source(3), 37.0, 0.0), points=lambda index: None, camera_height_m=made_up.CAMERA_HEIGHT
    )
    clip = ingest(source, tmp_path / "clip", workers=1)
    seen = ~made_up.sky(WIDTH, HEIGHT)
    np.testing.assert_allclose(clip.frame(1)["depth"][seen], made_up.road_depth(WIDTH, HEIGHT)[seen], rtol=1e-3)


def test_relative_depth_alone_is_refused(tmp_path: Path) -> None:
    source = dataclasses.replace(relative(made_up.source(3), 37.0, 0.0), points=lambda index: None)
    with pytest.raises(InputError, match="relative depth needs"):
        ingest(source, tmp_path / "clip", workers=1)
    assert not list(tmp_path.iterdir())


def test_a_video_of_a_level_road(tmp_path: Path) -> None:
    """No depth but the camera's height: on the road it is the plane's, and it is said to be an assumption."""
    width, height = 192, 128
    with VideoWriter(tmp_path / "road.mp4", fps=10) as writer:
        for index in range(3):
            writer.write(made_up.picture(width, height, index))
    clip = ingest(open_video(tmp_path / "road.mp4", camera_height_m=1.5), tmp_path / "clip", workers=1)
    assert set(clip.planes) == set(PLANES)
    frame = clip.frame(0)
    down = -(frame.camera.rays() @ frame.camera.camera_to_world[1, :3])
    near = (down > 0.1) & ~frame["sky"]
    np.testing.assert_allclose(frame["depth"][near], 1.5 / down[near], rtol=1e-4)
    assert any("level road" in sentence for sentence in clip.info.approximations)


def test_street(tmp_path: Path) -> None:
    clip = ingest_street(tmp_path / "clip", frames=2, width=80, height=44, workers=1)
    for index in range(2):
        exact, stored = street.frame(index, width=80, height=44), clip.frame(index)
        assert set(stored) == set(exact)
        np.testing.assert_array_equal(stored["depth"], exact["depth"])
        np.testing.assert_array_equal(stored["vehicle"], exact["vehicle"])
        np.testing.assert_allclose(stored["normal"], exact["normal"], atol=2.5e-5)
        assert stored.time == pytest.approx(exact.time)
        assert len(clip.boxes(index)) == len(street.boxes(index))
    assert clip.info.sky_depth_m == street.SKY_DEPTH_M


@pytest.mark.parametrize(("frames", "width"), [(0, 80), (-1, 80), (1, 0)])
def test_street_of_no_size(tmp_path: Path, frames: int, width: int) -> None:
    with pytest.raises(InputError):
        ingest_street(tmp_path / "clip", frames=frames, width=width, height=44)
    assert not list(tmp_path.iterdir())


def test_ordered_map_keeps_order_and_draws_late() -> None:
    drawn: list[int] = []

    def tasks() -> Iterator[int]:
        for number in range(20):
            drawn.append(number)
            yield -number

    results = ordered_map(abs, tasks(), workers=2)
    assert next(results) == 0
    assert len(drawn) <= 4
    assert list(results) == list(range(1, 20))


def first_frames(drive: Path, copy: Path, count: int) -> Path:
    """A drive of the first frames of another, without boxes."""
    for part in ("image_02", "velodyne_points", "oxts"):
        (copy / part / "data").mkdir(parents=True)
        for path in sorted((drive / part / "data").iterdir())[:count]:
            (copy / part / "data" / path.name).write_bytes(path.read_bytes())
    for path in drive.parent.glob("calib_*.txt"):
        (copy.parent / path.name).write_bytes(path.read_bytes())
    return copy


@pytest.mark.clip
def test_kitti_drive(kitti_drive: Path, tmp_path: Path) -> None:
    """End to end; the completed depth passes through the returns that the camera sees."""
    drive = first_frames(kitti_drive, tmp_path / "2011_09_26" / "Fahrt ä", 2)
    clip = ingest(open_kitti(drive), tmp_path / "clip", workers=1)
    assert set(clip.planes) == set(PLANES)
    frame, points = clip.frame(0), clip.points(0)
    np.testing.assert_array_equal(encode_srgb8(frame["rgb"]), open_kitti(drive).rgb(0))
    assert points is not None
    u, v, z = visible_uvz(points[:, :3], camera=frame.camera).T
    depth = frame["depth"][np.rint(v).astype(int), np.rint(u).astype(int)]
    assert np.median(np.abs(depth - z) / z) < 0.01
    assert 0.1 < frame["road"].mean() < 0.5


@pytest.mark.clip
def test_truncated_png_in_a_drive(kitti_drive: Path, tmp_path: Path) -> None:
    drive = first_frames(kitti_drive, tmp_path / "2011_09_26" / "drive", 1)
    (image,) = (drive / "image_02" / "data").iterdir()
    image.write_bytes(image.read_bytes()[:-5000])
    with pytest.raises(InputError, match=r"0000000010\.png: truncated"):
        ingest(open_kitti(drive), tmp_path / "clip", workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["2011_09_26"]
