"""A clip gives back what was written, or says in one line what is wrong with it; it is whole or it is no clip."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.clip import STORED, Clip, ClipInfo, ClipWriter, indices, iterate
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer

HEIGHT, WIDTH, FRAMES = 7, 13, 3
# What a stored code may differ from the value: half a step of the code, or of float16's 11 bits.
PRECISION = {"normal": 2.5e-5, "albedo": 2**-11, "emissive": 2**-11, "roughness": 0.5 / 255, "metallic": 0.5 / 255}


def make_info(count: int = FRAMES, **changes: object) -> ClipInfo:
    K = np.array([[10.0, 0, 6], [0, 10, 3], [0, 0, 1]])
    poses = np.tile(np.diag([1.0, -1, -1, 1]), (count, 1, 1))
    poses[:, 2, 3] = -np.arange(count)
    box = Box(track_id=4, category="Car", object_to_world=np.eye(4), size=(4.0, 1.5, 1.8))
    values: dict[str, object] = {
        "name": "made up",
        "width": WIDTH,
        "height": HEIGHT,
        "K": np.tile(K, (count, 1, 1)),
        "camera_to_world": poses,
        "times": np.arange(count) / 10,
        "world_origin": (5e5, 0.0, -4e6),
        "provenance": {"rgb": "dice"},
        "approximations": ["All of it."],
        "licence": "none",
        "environment": {"sky": [0.1, 0.2, 0.3]},
        "sky_depth_m": 80.0,
        "boxes": [[box]] * count,
    }
    return ClipInfo(**(values | changes))  # type: ignore[arg-type]


def make_frame(info: ClipInfo, index: int) -> GBuffer:
    rng = np.random.default_rng(index)
    shape = (info.height, info.width)
    normal = rng.normal(size=(*shape, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    planes = {
        "rgb": rng.random((*shape, 3)),
        "depth": rng.uniform(1, 100, shape),
        "normal": normal,
        "albedo": rng.random((*shape, 3)),
        "roughness": rng.random(shape),
        "emissive": rng.random((*shape, 3)) * 100,
    }
    exact = {
        "metallic": np.zeros(shape, np.float32),  # a plane of zeros is a plane too
        "sky": rng.random(shape) < 0.3,
        "road": np.zeros(shape, np.bool_),
        "vehicle": rng.integers(0, 2**15, shape, dtype=np.int32),
        "street_light": np.zeros(shape, np.int32),
    }
    return GBuffer(
        {name: plane.astype(np.float32) for name, plane in planes.items()} | exact,
        camera=info.camera(index),
        time=float(info.times[index]),
    )


def make_points(index: int) -> np.ndarray:
    return np.random.default_rng(100 + index).random((index * 5, 4)).astype(np.float32)


def write_clip(path: Path, info: ClipInfo | None = None, **options: bool) -> Clip:
    info = info or make_info()
    with ClipWriter(path, (len(info), info.height, info.width), fingerprint="test", **options) as writer:
        for index in range(len(info)):
            writer.write(index, make_frame(info, index), make_points(index))
        return writer.finish(info)


@pytest.fixture
def clip(tmp_path: Path) -> Clip:
    return write_clip(tmp_path / "Straße bei Nacht" / "clip")


def test_round_trip(clip: Clip) -> None:
    for index in range(FRAMES):
        written, read = make_frame(clip.info, index), clip.frame(index)
        assert set(read) == set(written)
        for name in written:
            if name == "rgb":  # eight bits: the same code, not the same value
                np.testing.assert_array_equal(STORED[name].encode(read[name]), STORED[name].encode(written[name]))
            elif name in ("albedo", "emissive"):
                np.testing.assert_allclose(read[name], written[name], rtol=PRECISION[name], atol=1e-7)
            else:
                np.testing.assert_allclose(read[name], written[name], rtol=0, atol=PRECISION.get(name, 0))
        np.testing.assert_array_equal(clip.points(index), make_points(index))


def test_info_round_trip(clip: Clip) -> None:
    assert clip.info.to_json() == make_info().to_json()
    assert clip.boxes(1)[0].category == "Car"


def test_one_plane_is_read_alone(clip: Clip) -> None:
    shutil.rmtree(clip.path / "albedo" / "c")
    assert list(clip.frame(0, ["depth"])) == ["depth"]


def test_frames_in_any_order(clip: Clip) -> None:
    backwards = list(iterate(clip, [2, 1, 0, 2]))
    np.testing.assert_array_equal(backwards[0]["depth"], backwards[3]["depth"])
    assert [frame.time for frame in backwards] == [0.2, 0.1, 0.0, 0.2]


@pytest.mark.parametrize("name", ["depth", "metallic", "sky"])
@pytest.mark.parametrize("fault", ["lost", "flipped", "truncated", "empty"])
def test_damaged_chunk_is_named(clip: Clip, name: str, fault: str) -> None:
    (chunk,) = (path for path in (clip.path / name / "c" / "1").rglob("*") if path.is_file())
    data = bytearray(chunk.read_bytes())
    if fault == "lost":
        chunk.unlink()
    elif fault == "flipped":
        data[len(data) // 2] ^= 1
        chunk.write_bytes(data)
    else:
        chunk.write_bytes(data[: len(data) // 2 if fault == "truncated" else 0])
    clip.frame(0)
    with pytest.raises(InputError, match=f"frame 1, {name}"):
        clip.frame(1)


def test_lost_points_are_named(clip: Clip) -> None:
    shutil.rmtree(clip.path / "points" / "000002" / "c")
    with pytest.raises(InputError, match="frame 2, points"):
        clip.points(2)


@pytest.mark.parametrize("index", [-1, FRAMES])
def test_no_such_frame(clip: Clip, index: int) -> None:
    with pytest.raises(InputError, match=f"0:{FRAMES}"):
        clip.frame(index)


@pytest.mark.parametrize("kind", ["nothing", "file", "empty folder", "zarr of another kind"])
def test_not_a_clip(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "thing"
    if kind == "file":
        path.write_text("hello")
    elif kind == "empty folder":
        path.mkdir()
    elif kind == "zarr of another kind":
        import zarr

        zarr.open_group(path, mode="w").attrs["format"] = "something"
    with pytest.raises(InputError, match="no such clip" if kind == "nothing" else "expected a clip") as caught:
        Clip(path)
    assert "\n" not in str(caught.value)


def test_unfinished_is_no_clip(tmp_path: Path) -> None:
    info = make_info()
    with ClipWriter(tmp_path / "clip", (FRAMES, HEIGHT, WIDTH), fingerprint="a") as writer:
        writer.write(0, make_frame(info, 0))
        with pytest.raises(InputError, match=r"frames \[1, 2\]"):
            writer.finish(info)
    for folder in [tmp_path, *(path for path in tmp_path.rglob("*") if path.is_dir())]:
        with pytest.raises(InputError, match="expected a clip"):
            Clip(folder)


def test_resumes_under_the_same_fingerprint_only(tmp_path: Path) -> None:
    info, shape = make_info(), (FRAMES, HEIGHT, WIDTH)
    with ClipWriter(tmp_path / "clip", shape, fingerprint="a") as writer:
        writer.write(1, make_frame(info, 1))
    with ClipWriter(tmp_path / "clip", shape, fingerprint="a") as writer:
        assert writer.done == {1}
    with ClipWriter(tmp_path / "clip", shape, fingerprint="b") as writer:
        assert not writer.done
    with ClipWriter(tmp_path / "clip", shape, fingerprint="a") as writer:
        assert not writer.done


def test_two_writers_of_one_clip(tmp_path: Path) -> None:
    shape = (FRAMES, HEIGHT, WIDTH)
    with (
        ClipWriter(tmp_path / "clip", shape, fingerprint="a"),
        pytest.raises(InputError, match="another process"),
    ):
        ClipWriter(tmp_path / "clip", shape, fingerprint="a")


def test_existing_clip_is_kept_without_overwrite(clip: Clip) -> None:
    with pytest.raises(InputError, match="overwrite"):
        write_clip(clip.path)
    Clip(clip.path).frame(0)


def test_overwrite_replaces_a_clip_and_leaves_neighbours(clip: Clip) -> None:
    neighbour = clip.path.with_name(clip.path.name + ".old")
    neighbour.mkdir()
    (neighbour / "notes.txt").write_text("mine")
    again = write_clip(clip.path, make_info(2), overwrite=True)
    assert len(again) == 2
    assert (neighbour / "notes.txt").read_text() == "mine"
    assert sorted(path.name for path in clip.path.parent.iterdir()) == ["clip", "clip.old"]


def test_overwrite_never_replaces_what_is_no_clip(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.txt").write_text("mine")
    with pytest.raises(InputError, match="expected a clip"):
        write_clip(tmp_path / "photos", overwrite=True)
    assert (tmp_path / "photos" / "one.txt").read_text() == "mine"


@pytest.mark.parametrize("target", ["file/clip", "unwritable/clip"])
def test_unwritable_target(tmp_path: Path, target: str) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "unwritable").mkdir(mode=0o555)
    if target.startswith("unwritable") and os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    with pytest.raises(InputError, match="cannot be written"):
        write_clip(tmp_path / target)


def test_wrong_size_is_refused(tmp_path: Path) -> None:
    info = make_info(width=WIDTH + 1)
    with (
        ClipWriter(tmp_path / "clip", (FRAMES, HEIGHT, WIDTH), fingerprint="a") as writer,
        pytest.raises(InputError, match="expected size"),
    ):
        writer.write(0, make_frame(info, 0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"times": np.array([0.0, 0.0, 0.1])}, "increasing"),
        ({"times": np.empty(0)}, "at least one frame"),
        ({"K": np.eye(3)}, "expected K"),
    ],
)
def test_info_is_checked(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_info(**changes)


def test_a_single_pixel_and_a_single_frame(tmp_path: Path) -> None:
    info = make_info(1, width=1, height=1)
    clip = write_clip(tmp_path / "clip", info)
    assert clip.frame(0)["rgb"].shape == (1, 1, 3)
    assert isinstance(clip.frame(0).camera, Camera)


@pytest.mark.parametrize(
    ("text", "expected"), [(None, range(10)), ("2:5", range(2, 5)), (":3", range(3)), ("8:", range(8, 10))]
)
def test_indices(text: str | None, expected: range) -> None:
    assert indices(text, 10) == expected


@pytest.mark.parametrize("text", ["12", "a", "a:b", "7:7", "20:30", ""])
def test_bad_indices(text: str) -> None:
    with pytest.raises(InputError, match="--frames"):
        indices(text, 10)
