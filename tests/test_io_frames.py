"""A folder of planes: every admitted file gives the same plane, and what does not fit is told by name."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aw4d.colour import decode_srgb8
from aw4d.errors import InputError
from aw4d.io.frames import open_frames
from aw4d.io.images import exr_channels, write_exr, write_png
from aw4d.io.source import Source

HEIGHT, WIDTH, STEMS = 12, 20, ("000", "001", "010")
K = [[15.0, 0, 9.5], [0, 15.0, 5.5], [0, 0, 1]]
RNG = np.random.default_rng(0)
DEPTH = RNG.uniform(2, 80, (HEIGHT, WIDTH)).astype(np.float32)


def save(path: Path, values: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".exr":
        write_exr(path, exr_channels(values.astype(np.float32)))
    else:
        write_png(path, values)


def save_all(folder: Path, name: str, suffix: str, values: np.ndarray) -> None:
    for stem in STEMS:
        save(folder / name / f"{stem}{suffix}", values)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "Aufnahme ä"
    save_all(folder, "rgb", ".png", RNG.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8))
    (folder / "intrinsics.json").write_text(json.dumps({"K": K}))
    return folder


def with_depth(folder: Path, values: np.ndarray = DEPTH, suffix: str = ".npy", **options: float | bool) -> Source:
    save_all(folder, "depth", suffix, values)
    return open_frames(folder, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("suffix", "values", "step"),
    [
        (".npy", DEPTH, 0.0),
        (".npy", DEPTH[..., None].astype(np.float64), 1e-6),
        (".npy", DEPTH.astype(np.float16), 0.04),
        (".exr", DEPTH, 0.0),
        (".png", np.rint(DEPTH * 256).astype(np.uint16), 0.5 / 256),
    ],
)
def test_depth_files(folder: Path, suffix: str, values: np.ndarray, step: float) -> None:
    depth = with_depth(folder, values, suffix).planes(0)["depth"]
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, DEPTH, rtol=0, atol=step)


def test_depth_scale(folder: Path) -> None:
    millimetres = np.rint(np.minimum(DEPTH, 65) * 1000).astype(np.uint16)
    depth = with_depth(folder, millimetres, ".png", depth_scale=1e-3).planes(0)["depth"]
    np.testing.assert_allclose(depth, np.minimum(DEPTH, 65), atol=5.1e-4)


@pytest.mark.parametrize("factor", [1e-3, 1e-2, 1e6])
def test_wrong_depth_unit(folder: Path, factor: float) -> None:
    with pytest.raises(InputError, match="--depth-scale"):
        with_depth(folder, DEPTH * factor).planes(0)


@pytest.mark.parametrize("hole", [0, -1, np.nan, np.inf, -np.inf])
def test_holes_are_filled_from_their_neighbours(folder: Path, hole: float) -> None:
    holey = DEPTH.copy()
    holey[3, 4] = hole
    depth = with_depth(folder, holey).planes(0)["depth"]
    assert depth[3, 4] in DEPTH[2:5, 3:6]
    np.testing.assert_array_equal(np.delete(depth.ravel(), 3 * WIDTH + 4), np.delete(DEPTH.ravel(), 3 * WIDTH + 4))


def test_sparse_depth_becomes_returns(folder: Path) -> None:
    sparse = np.where(RNG.random(DEPTH.shape) < 0.1, DEPTH, 0)
    source = with_depth(folder, sparse)
    assert "depth" not in source.planes(0)
    points = source.points(0)
    assert points is not None
    u, v, z = source.info.camera(0).project(points[:, :3]).T
    np.testing.assert_allclose(z, sparse[np.rint(v).astype(int), np.rint(u).astype(int)], rtol=1e-6)
    assert len(points) == np.count_nonzero(sparse)


@pytest.mark.parametrize("values", [np.zeros_like(DEPTH), np.full_like(DEPTH, np.nan), -DEPTH])
def test_no_depth_at_all(folder: Path, values: np.ndarray) -> None:
    with pytest.raises(InputError, match="depth: expected metres"):
        with_depth(folder, values).planes(0)


def test_depth_of_another_size(folder: Path) -> None:
    with pytest.raises(InputError, match=r"000\.npy: depth: expected \(12, 20\)"):
        with_depth(folder, DEPTH.T).planes(0)


def test_colour_and_scalar_planes(folder: Path) -> None:
    code = RNG.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    save_all(folder, "albedo", ".png", code)
    save_all(folder, "emissive", ".exr", code.astype(np.float32))
    save_all(folder, "roughness", ".png", code[..., 0])
    save_all(folder, "metallic", ".png", code[..., 1].astype(np.uint16) * 257)
    save_all(folder, "sky", ".png", ((code[..., 2] > 99) * 255).astype(np.uint8))
    save_all(folder, "road", ".npy", code[..., 2] > 99)
    save_all(folder, "vehicle", ".png", code[..., 0].astype(np.uint16) * 7)
    planes = with_depth(folder).planes(1)
    np.testing.assert_array_equal(planes["albedo"], decode_srgb8(code))
    np.testing.assert_array_equal(planes["emissive"], code)
    np.testing.assert_allclose(planes["roughness"], code[..., 0] / 255, atol=1e-7)
    np.testing.assert_allclose(planes["metallic"], code[..., 1] / 255, atol=1e-7)
    np.testing.assert_array_equal(planes["sky"], planes["road"])
    np.testing.assert_array_equal(planes["vehicle"], code[..., 0].astype(int) * 7)


@pytest.mark.parametrize("kind", ["npy", "exr", "png"])
def test_normals(folder: Path, kind: str) -> None:
    normal = RNG.normal(size=(HEIGHT, WIDTH, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    values = np.rint((normal + 1) / 2 * 255).astype(np.uint8) if kind == "png" else normal.astype(np.float32)
    save_all(folder, "normal", f".{kind}", values)
    read = with_depth(folder).planes(0)["normal"]
    np.testing.assert_allclose(read, normal, atol=0.012 if kind == "png" else 1e-6)
    np.testing.assert_allclose(np.linalg.norm(read, axis=-1), 1, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("normal", np.zeros((HEIGHT, WIDTH, 3), np.float32), "unit normals"),
        ("normal", np.full((HEIGHT, WIDTH, 3), np.nan, np.float32), "unit normals"),
        ("albedo", np.full((HEIGHT, WIDTH, 3), 1.5, np.float32), r"within \[0, 1\]"),
        ("albedo", np.zeros((HEIGHT, WIDTH), np.float32), "three channels"),
        ("roughness", np.full((HEIGHT, WIDTH), np.nan, np.float32), "NaN"),
        ("roughness", np.tile(np.float32([0, 0.1, 0.2]), (HEIGHT, WIDTH, 1)), "one channel"),
        ("vehicle", np.full((HEIGHT, WIDTH), -1), "instance numbers"),
        ("vehicle", np.full((HEIGHT, WIDTH), 1.5), "instance numbers"),
        ("sky", np.zeros((HEIGHT, WIDTH + 1), np.bool_), "sky: expected"),
    ],
)
def test_faulty_planes_are_named(folder: Path, name: str, values: np.ndarray, message: str) -> None:
    save_all(folder, name, ".npy", values)
    with pytest.raises(InputError, match=rf"000\.npy: .*{message}"):
        with_depth(folder).planes(0)


def test_an_array_of_objects_is_not_read(folder: Path) -> None:
    save_all(folder, "sky", ".npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="array of numbers"):
        with_depth(folder).planes(0)


def test_truncated_npy(folder: Path) -> None:
    source = with_depth(folder)
    path = folder / "depth" / "001.npy"
    path.write_bytes(path.read_bytes()[:-10])
    source.planes(0)
    with pytest.raises(InputError, match=r"001\.npy"):
        source.planes(1)


@pytest.mark.parametrize(
    ("lost", "message"), [("001", "no file for 1 of 3 pictures: 001"), (None, "without a picture: 99")]
)
def test_pairing(folder: Path, lost: str | None, message: str) -> None:
    save_all(folder, "depth", ".npy", DEPTH)
    if lost:
        (folder / "depth" / f"{lost}.npy").unlink()
    else:
        save(folder / "depth" / "99.npy", DEPTH)
    with pytest.raises(InputError, match=message):
        open_frames(folder)


def test_pictures_of_two_sizes(folder: Path) -> None:
    save(folder / "rgb" / "001.png", np.zeros((HEIGHT, WIDTH + 2, 3), np.uint8))
    source = with_depth(folder)
    with pytest.raises(InputError, match=r"001\.png: expected 20x12 .*, got 22x12"):
        source.rgb(1)


def test_calibration(folder: Path) -> None:
    np.testing.assert_array_equal(with_depth(folder).info.K[2], K)
    (folder / "intrinsics.json").write_text(json.dumps({"fx": 15, "fy": 15, "cx": 9.5, "cy": 5.5}))
    np.testing.assert_array_equal(open_frames(folder).info.K[0], K)
    (folder / "intrinsics.json").unlink()
    with pytest.raises(InputError, match="missing calibration"):
        open_frames(folder)
    np.testing.assert_array_equal(open_frames(folder, focal_px=15).info.K[0], K)
    assert open_frames(folder, fov_deg=90).info.K[0, 0, 0] == pytest.approx(WIDTH / 2)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '{"fx": 1}', '{"K": [[1, 0], [0, 1]]}', '{"K": "x"}'])
def test_bad_intrinsics(folder: Path, text: str) -> None:
    save_all(folder, "depth", ".npy", DEPTH)
    (folder / "intrinsics.json").write_text(text)
    with pytest.raises(InputError, match=r"intrinsics\.json"):
        open_frames(folder)


def test_poses_and_times(folder: Path) -> None:
    poses = np.tile(np.diag([1.0, -1, -1, 1]), (3, 1, 1))
    poses[:, :3, 3] = [(5e5, 2, -4e6), (5e5, 2, -4e6 - 1), (5e5, 2, -4e6 - 2)]
    np.savetxt(folder / "times.txt", [100.0, 100.5, 101.5])
    for write in (
        lambda: (folder / "poses.json").write_text(json.dumps(poses.tolist())),
        lambda: np.savetxt(folder / "poses.txt", poses.reshape(3, 16)),
        lambda: np.savetxt(folder / "poses.txt", poses[:, :3].reshape(3, 12)),
    ):
        write()
        info = with_depth(folder).info
        np.testing.assert_allclose(info.camera_to_world[:, :3, 3], [(0, 0, 0), (0, 0, -1), (0, 0, -2)], atol=1e-9)
        assert info.world_origin == (5e5, 2, -4e6)
        np.testing.assert_allclose(info.times, [0, 0.5, 1.5])
        (folder / "poses.json").unlink(missing_ok=True)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("poses.txt", "1 2 3\n"),
        ("poses.txt", "x y z\n"),
        ("poses.json", "[1]"),
        ("times.txt", "0\n1\n"),
        ("times.txt", "0\nnan\n2\n"),
    ],
)
def test_bad_poses_and_times(folder: Path, name: str, text: str) -> None:
    save_all(folder, "depth", ".npy", DEPTH)
    (folder / name).write_text(text)
    with pytest.raises(InputError, match=name):
        open_frames(folder)


def test_points(folder: Path) -> None:
    for index, stem in enumerate(STEMS):
        save(folder / "points" / f"{stem}.npy", np.full((5, 3 + index % 2), 2.0))
    source = open_frames(folder)
    np.testing.assert_array_equal(source.points(0), [[2, 2, 2, 0]] * 5)
    np.testing.assert_array_equal(source.points(1), [[2, 2, 2, 1]] * 5)  # reflectance within 0..1


def test_nothing_to_take_depth_from(folder: Path) -> None:
    with pytest.raises(InputError, match="depth/, points/ or the height"):
        open_frames(folder)
    assert open_frames(folder, camera_height_m=1.5).camera_height_m == 1.5
    with pytest.raises(InputError, match="relative depth needs"):
        with_depth(folder, relative_depth=True)


@pytest.mark.parametrize("name", ["nowhere", "empty"])
def test_no_pictures(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty" / "rgb").mkdir(parents=True)
    with pytest.raises(InputError, match="expected pictures"):
        open_frames(tmp_path / name)
