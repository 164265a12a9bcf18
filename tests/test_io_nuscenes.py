"""nuScenes keyframes: geometry against the recording's own 2D boxes, and pickles that are programs refused."""

from __future__ import annotations

import os
import pickle
import shutil
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.io.images import write_png
from aw4d.io.nuscenes import open_nuscenes
from aw4d.io.safe_pickle import read_plain_pickle


@pytest.fixture
def sample(test_data: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "Singapur Süd"
    shutil.copytree(test_data / "nuscenes_sample", copy)
    for path in copy.iterdir():
        path.chmod(0o644)
    copy.chmod(0o755)
    return copy


class Program:
    """What a malicious pickle does when it is read."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self.call = (function, arguments)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self.call


def test_plain_data_is_read(tmp_path: Path) -> None:
    data = {"a": [1, 2.5, "x", None, True, (1, 2), {3}, b"raw"], "b": np.arange(6.0).reshape(2, 3), "c": np.float32(1)}
    data["d"] = OrderedDict(x=1)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        (tmp_path / "a.pkl").write_bytes(pickle.dumps(data, protocol=protocol))
        read = read_plain_pickle(tmp_path / "a.pkl")
        np.testing.assert_array_equal(read.pop("b"), data["b"])
        assert read == {key: value for key, value in data.items() if key != "b"}


@pytest.mark.parametrize("function", [os.system, eval, exec, print, open, getattr, __import__])
def test_programs_are_not_run(tmp_path: Path, function: Callable[..., Any]) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps([1, Program(function, f"touch {tmp_path / 'run'}")]))
    with pytest.raises(InputError, match="plain data"):
        read_plain_pickle(tmp_path / "a.pkl")
    assert not (tmp_path / "run").exists()


def test_truncated_pickle(tmp_path: Path) -> None:
    data = pickle.dumps({"a": list(range(100))})
    for size in (1, 10, len(data) - 1):
        (tmp_path / "a.pkl").write_bytes(data[:size])
        with pytest.raises(InputError, match="plain data"):
            read_plain_pickle(tmp_path / "a.pkl")


@pytest.mark.clip
def test_boxes_project_where_the_recording_says(sample: Path) -> None:
    """The info file holds projected centres for the camera; ours come from the scanner's frame, valid boxes only."""
    info = open_nuscenes(sample).info
    camera = info.camera(0)
    data = read_plain_pickle(next(sample.glob("*.pkl")))["data_list"][0]
    expected = np.array([(*box["center_2d"], box["depth"]) for box in data["cam_instances"]["CAM_FRONT"]])
    centres = np.array([camera.project(camera.to_camera(box.object_to_world[:3, 3])) for box in info.boxes[0]])
    centres = centres[centres[:, 2] > 0]
    found = np.abs(centres[None] - expected[:, None]).max(axis=2).min(axis=1) < 0.1
    unseen = sum(not instance["bbox_3d_isvalid"] for instance in data["instances"])
    assert np.count_nonzero(~found) <= unseen


@pytest.mark.clip
def test_boxes_hold_the_returns_that_the_recording_counts(sample: Path) -> None:
    source = open_nuscenes(sample)
    points = source.points(0)
    assert points is not None
    world = source.info.camera(0).to_world(points[:, :3])
    instances = read_plain_pickle(next(sample.glob("*.pkl")))["data_list"][0]["instances"]
    valid = [instance for instance in instances if instance["bbox_3d_isvalid"]]
    assert len(valid) == len(source.info.boxes[0])
    counts = np.array([np.count_nonzero(box.contains(world)) for box in source.info.boxes[0]])
    expected = np.array([int(instance["num_lidar_pts"]) for instance in valid])
    assert (np.abs(counts - expected) <= 2 + 0.1 * expected).all()


@pytest.mark.clip
def test_up_is_up(sample: Path) -> None:
    info = open_nuscenes(sample).info
    assert (info.camera_to_world[0][:3, :3] @ (0, -1, 0))[1] > 0.999
    np.testing.assert_array_equal(info.camera_to_world[0][:3, 3], 0)
    heading = [box.object_to_world[:3, 1] for box in info.boxes[0]]
    assert np.min(heading, axis=0)[1] > 0.99


@pytest.mark.clip
@pytest.mark.parametrize("pattern", ["*.pkl", "*.jpg", "*.pcd.bin"])
@pytest.mark.parametrize("fault", ["lost", "truncated"])
def test_faults(sample: Path, pattern: str, fault: str) -> None:
    (path,) = sample.glob(pattern)
    if fault == "lost":
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:-1001])

    def read() -> None:
        source = open_nuscenes(sample)
        source.rgb(0)
        source.points(0)

    with pytest.raises(InputError, match=path.suffix if fault == "truncated" else "expected") as caught:
        read()
    assert "\n" not in str(caught.value)


@pytest.mark.clip
@pytest.mark.parametrize("key", ["images", "lidar_points", "ego2global"])
def test_lost_keys(sample: Path, key: str) -> None:
    (path,) = sample.glob("*.pkl")
    info = read_plain_pickle(path)
    del info["data_list"][0][key]
    path.write_bytes(pickle.dumps(info))
    with pytest.raises(InputError, match=key):
        open_nuscenes(sample)


@pytest.mark.clip
@pytest.mark.parametrize("count", [0, 3, -5, float("inf"), None])
def test_returns_of_no_width(sample: Path, count: object) -> None:
    (path,) = sample.glob("*.pkl")
    info = read_plain_pickle(path)
    info["data_list"][0]["lidar_points"]["num_pts_feats"] = count
    path.write_bytes(pickle.dumps(info))
    with pytest.raises(InputError, match=r"\.pkl"):
        open_nuscenes(sample)


@pytest.mark.clip
@pytest.mark.parametrize(
    "instances", [[5], [{}], [{"bbox_3d": [1, 2]}], [{"bbox_3d": [0.0] * 7, "bbox_label_3d": float("inf")}]]
)
def test_boxes_of_something_else(sample: Path, instances: list[object]) -> None:
    (path,) = sample.glob("*.pkl")
    info = read_plain_pickle(path)
    info["data_list"][0]["instances"] = instances
    path.write_bytes(pickle.dumps(info))
    with pytest.raises(InputError, match="boxes of 7 numbers"):
        open_nuscenes(sample)


@pytest.mark.parametrize("data", [[], {}, {"data_list": [1]}, 5, {"metainfo": {"categories": {}}, "data_list": []}])
def test_pickles_of_something_else(tmp_path: Path, data: object) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(data))
    with pytest.raises(InputError):
        open_nuscenes(tmp_path)


def test_empty_folder(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(InputError, match=r"\*\.pkl"):
        open_nuscenes(tmp_path)
