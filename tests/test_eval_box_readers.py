"""Files of boxes: every format gives the same camera-frame corners; what is malformed is named."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aw4d.boxes import Box
from aw4d.io.kitti_geometry import find_calibration, read_calibration
from aw4d.io.kitti_geometry import read_boxes as read_tracklets
from aw4d.io.safe_pickle import read_plain_pickle
from eval.box_iou import Rectangle, iou, visible
from eval.box_readers import (
    boxes_of_layers,
    read_boxes,
    read_category_names,
    read_kitti_frames,
    read_kitti_tracking,
    read_layers,
    read_nuscenes,
    read_ovmono3d,
    read_projection,
    read_waymo,
)
from eval.boxes import Box3D, Camera, cuboid, kind
from eval.errors import MetricError, MissingError
from eval.values import Undefined

Array = NDArray[np.float64]

LENGTH, WIDTH, HEIGHT = 4.5, 2.0, 1.6
CENTRE = (3.0, 1.2, 15.0)  # camera frame
YAW = 0.4  # from the camera's x towards its -z: clockwise, seen from above


def car() -> Array:
    """Corners of the car that every file below describes."""
    forward, down = np.array([np.cos(YAW), 0, -np.sin(YAW)]), np.array([0.0, 1, 0])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([forward, down, np.cross(forward, down)])
    pose[:3, 3] = CENTRE
    return cuboid(pose, (LENGTH, HEIGHT, WIDTH))


def same(a: Array, b: Array) -> bool:
    """The same eight corners, in any order."""
    return bool(np.linalg.norm(a[:, None] - b, axis=2).min(axis=1).max() < 1e-6)


def write(path: Path, content: Any) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return path


def random_pose(seed: int) -> Array:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    pose[:3, 3] = 100.0, -7, 30
    return pose


class TestOVMono3D:
    def result(self) -> dict[str, Any]:
        return {
            "image_id": 7,
            "category_id": 2,
            "bbox": [0, 0, 1, 1],
            "score": 0.5,
            "bbox3D": car().tolist(),
            "dimensions": [WIDTH, HEIGHT, LENGTH],
        }

    def test_reads(self, tmp_path: Path) -> None:
        (box,) = read_ovmono3d(write(tmp_path / "r.json", [self.result()]), {2: "car"})["7"]
        assert same(box.corners, car())
        assert (box.category, box.score, box.track_id) == ("car", 0.5, None)

    def test_names_of_categories(self, tmp_path: Path) -> None:
        names = read_category_names(write(tmp_path / "c.json", {"categories": [{"id": 2, "name": "car"}]}))
        assert names == {2: "car"}
        with pytest.raises(MetricError, match=r"entry 0: category_id: expected one of \[1\], got 2"):
            read_ovmono3d(write(tmp_path / "r.json", [self.result()]), {1: "car"})

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"bbox3D": [[0, 0, 1]]}, r"entry 1: corners: expected \(8, 3\)"),
            ({"bbox3D": "eight"}, "entry 1: expected an object with image_id"),
            ({"score": None}, "entry 1: expected an object with image_id"),
        ],
    )
    def test_malformed_entry_is_named(self, tmp_path: Path, change: dict[str, Any], message: str) -> None:
        with pytest.raises(MetricError, match=rf"r\.json: {message}"):
            read_ovmono3d(write(tmp_path / "r.json", [self.result(), self.result() | change]))

    def test_missing_key_is_named(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match=r"entry 0: .*'bbox3D'"):
            read_ovmono3d(write(tmp_path / "r.json", [{"image_id": 1, "category_id": 1, "score": 1}]))


class TestKITTI:
    # h w l, the middle of the bottom, rotation_y
    FIELDS = (
        f"Car 0 0 0 100 100 200 200 {HEIGHT} {WIDTH} {LENGTH} {CENTRE[0]} {CENTRE[1] + HEIGHT / 2} {CENTRE[2]} {YAW}"
    )

    def test_tracking(self, tmp_path: Path) -> None:
        region = "0 -1 DontCare -1 -1 -10 1 1 2 2 -1 -1 -1 -1000 -1000 -1000 -10"
        text = "\n".join([region, f"12 3 {self.FIELDS}", f"13 3 {self.FIELDS} 0.9"])
        boxes = read_kitti_tracking(write(tmp_path / "0000.txt", text), np.eye(3))
        assert list(boxes) == ["12", "13"]
        assert same(boxes["12"][0].corners, car())
        assert (boxes["12"][0].track_id, boxes["12"][0].score, boxes["13"][0].score) == ("3", None, 0.9)

    def test_frames(self, tmp_path: Path) -> None:
        write(tmp_path / "000012.txt", f"{self.FIELDS}\n")
        (box,) = read_kitti_frames(tmp_path, np.eye(3))["12"]
        assert same(box.corners, car())
        assert box.track_id is None

    def test_labels_are_seen_by_the_camera_of_p2(self, tmp_path: Path) -> None:
        """P2 X of the labels' frame and K X of the reader's project to the same pixels."""
        P2 = np.array([[700.0, 0, 600, 45], [0, 700, 180, 0.2], [0, 0, 1, 0.003]])
        write(tmp_path / "000000.txt", f"{self.FIELDS}\n")
        (box,) = read_kitti_frames(tmp_path, P2)["0"]
        expected = np.column_stack([car(), np.ones(8)]) @ P2.T
        found = box.corners @ P2[:, :3].T
        assert same(found / found[:, 2:], expected / expected[:, 2:])

    def test_real_labels_equal_those_of_ingested_clips(self, kitti_drive: Path) -> None:
        paths = [find_calibration(kitti_drive, name) for name in ("calib_cam_to_cam.txt", "calib_velo_to_cam.txt")]
        cam_to_cam, velo_to_cam = paths
        assert cam_to_cam is not None
        assert velo_to_cam is not None
        label, frames = kitti_drive / "label_02_0003.txt", range(10, 67)
        calibration = read_calibration(cam_to_cam, velo_to_cam)
        poses = np.tile(np.eye(4), (len(frames), 1, 1))  # the world is the camera's frame
        ingested = read_tracklets(label, frames, poses, calibration)
        found = read_kitti_tracking(label, read_projection(cam_to_cam))
        assert sum(map(len, found.values())) == sum(map(len, ingested)) > 57
        for frame, expected in zip(frames, ingested, strict=True):
            for a, b in zip(found.get(str(frame), ()), expected, strict=True):
                assert (a.track_id, a.category) == (str(b.track_id), b.category)
                assert np.linalg.norm(a.corners[:, None] - b.corners(), axis=2).min(axis=1).max() < 0.01

    def test_real_boxes_agree_with_the_labelled_rectangles(self, kitti_drive: Path) -> None:
        """Rectangles in the label file are drawn about the same boxes: visible ones cover nearly the same pixels."""
        label = kitti_drive / "label_02_0003.txt"
        projection = read_projection(kitti_drive.parent / "calib_cam_to_cam.txt")
        camera = Camera(K=projection[:, :3], width=1242, height=375)
        lines = [line.split() for line in label.read_text(encoding="utf-8").splitlines()]
        drawn = {(line[0], line[1]): [float(value) for value in line[6:10]] for line in lines if line[2] != "DontCare"}
        values = []
        for frame, boxes in read_kitti_tracking(label, projection).items():
            for box in boxes:
                rectangle = visible(box.corners, camera)
                if not isinstance(rectangle, Undefined) and box.track_id is not None:
                    values.append(iou(rectangle, Rectangle(*drawn[frame, box.track_id])))
        assert len(values) > 57
        assert np.median(np.array(values, dtype=np.float64)) > 0.95

    @pytest.mark.parametrize("line", ["1 2 Car 0 0", "x 2 Car" + " 0" * 14, "1 2 Car" + " a" * 14, "7"])
    def test_malformed_line_is_named(self, tmp_path: Path, line: str) -> None:
        path = write(tmp_path / "0000.txt", f"12 3 {self.FIELDS}\n{line}\n")
        with pytest.raises(MetricError, match=r"0000\.txt: line 2: expected"):
            read_kitti_tracking(path, np.eye(3))

    def test_no_files(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match=r"label files \*\.txt, got none"):
            read_kitti_frames(tmp_path, np.eye(3))

    def test_projection(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match="P2, "):
            read_kitti_frames(tmp_path, np.zeros((3, 4)))
        with pytest.raises(MetricError, match="got 0"):
            read_projection(write(tmp_path / "calib.txt", "P3: 1 2 3\n"))
        with pytest.raises(MetricError, match="expected 12 numbers"):
            read_projection(write(tmp_path / "calib.txt", "P2: 1 2 3\n"))


class TestNuScenes:
    def item(self, to_world: Array) -> dict[str, Any]:
        # Axes of a box: x forward, y left, z up; of the camera: x right, y down, z forward.
        forward, up = np.array([np.cos(YAW), 0, -np.sin(YAW)]), np.array([0.0, -1, 0])
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([forward, np.cross(up, forward), up])
        pose[:3, 3] = CENTRE
        pose = to_world @ pose
        return {
            "translation": pose[:3, 3].tolist(),
            "size": [WIDTH, LENGTH, HEIGHT],
            "rotation": Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True).tolist(),
            "detection_name": "car",
            "detection_score": 0.7,
        }

    def test_in_the_camera_frame(self, tmp_path: Path) -> None:
        path = write(tmp_path / "r.json", {"meta": {}, "results": {"ca9a": [self.item(np.eye(4))]}})
        (box,) = read_nuscenes(path)["ca9a"]
        assert same(box.corners, car())
        assert (box.category, box.score, box.track_id) == ("car", 0.7, None)

    def test_in_the_world(self, tmp_path: Path) -> None:
        pose = random_pose(1)
        item = self.item(pose) | {"tracking_id": 5}
        (box,) = read_nuscenes(write(tmp_path / "r.json", {"results": {"a": [item]}}), {"a": pose})["a"]
        assert same(box.corners, car())
        assert box.track_id == "5"

    def test_real_boxes_agree_with_their_rectangles(self, test_data: Path, tmp_path: Path) -> None:
        """The sample's own rectangles are of boxes that stand upright in the world; these stand upright in the camera.

        They fit to a few percent, and worse when the boxes are turned or mirrored.
        """
        sample = read_plain_pickle(next((test_data / "nuscenes_sample").glob("*.pkl")))["data_list"][0]
        camera = Camera(K=np.array(sample["images"]["CAM_FRONT"]["cam2img"]), width=1600, height=900)
        instances = sample["cam_instances"]["CAM_FRONT"]

        def fit(sign: float, turn: float) -> list[float]:
            items = [_camera_item(instance["bbox_3d"], sign, turn) for instance in instances]
            found = read_nuscenes(write(tmp_path / "r.json", {"results": {"0": items}}))["0"]
            rectangles = [visible(box.corners, camera) for box in found]
            assert not any(isinstance(rectangle, Undefined) for rectangle in rectangles)
            drawn = [Rectangle(*instance["bbox"]) for instance in instances]
            return [iou(a, b) for a, b in zip(rectangles, drawn, strict=True)]

        best = fit(1, 0)
        assert len(best) > 40
        assert min(best) > 0.9
        for sign, turn in ((1, 0.05), (1, -0.05), (1, np.pi / 2), (-1, 0)):
            assert np.mean(fit(sign, turn)) < np.mean(best)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"size": [1, 2]}, "expected an object with translation"),
            ({"size": [1, 2, -3]}, "box: expected three positive lengths"),
            ({"rotation": [1, 1, 0, 0]}, "rotation: expected a unit quaternion"),
            ({"detection_name": None}, "expected one of detection_name"),
        ],
    )
    def test_malformed_entry_is_named(self, tmp_path: Path, change: dict[str, Any], message: str) -> None:
        path = write(tmp_path / "r.json", {"results": {"a": [self.item(np.eye(4)) | change]}})
        with pytest.raises(MetricError, match=rf"r\.json: sample a, box 0: {message}"):
            read_nuscenes(path)

    def test_pose_is_missing(self, tmp_path: Path) -> None:
        path = write(tmp_path / "r.json", {"results": {"a": [self.item(np.eye(4))]}})
        with pytest.raises(MetricError, match="sample a: expected a camera pose of frame a"):
            read_nuscenes(path, {"b": np.eye(4)})

    def test_another_file(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match='an object with "results"'):
            read_nuscenes(write(tmp_path / "r.json", []))


def _camera_item(box: list[float], sign: float, turn: float) -> dict[str, Any]:
    """A box of an info file, in the camera frame: place, length, height, width, yaw about y; nuScenes' item of it."""
    x, y, z, length, height, width, yaw = (float(value) for value in box)
    yaw = sign * yaw + turn
    forward, up = np.array([np.cos(yaw), 0, -np.sin(yaw)]), np.array([0.0, -1, 0])
    rotation = np.column_stack([forward, np.cross(up, forward), up])
    return {
        "translation": [x, y, z],
        "size": [width, length, height],
        "rotation": Rotation.from_matrix(rotation).as_quat(scalar_first=True).tolist(),
        "detection_name": "car",
    }


class TestWaymo:
    # The camera looks along the vehicle's x; its axes are x forward, y left, z up.
    EXTRINSIC = np.array([[1.0, 0, 0, 1.5], [0, 1, 0, 0.1], [0, 0, 1, 2.1], [0, 0, 0, 1]])
    BOX: ClassVar = {
        "center_x": CENTRE[2] + 1.5,
        "center_y": -CENTRE[0] + 0.1,
        "center_z": -CENTRE[1] + 2.1,
        "length": LENGTH,
        "width": WIDTH,
        "height": HEIGHT,
        "heading": -YAW - np.pi / 2,
    }

    def test_reads(self, tmp_path: Path) -> None:
        label = {"box": self.BOX, "type": 1, "id": "abc"}
        path = write(tmp_path / "f.json", [{"frame": 3, "laser_labels": [label]}])
        (box,) = read_waymo(path, self.EXTRINSIC)["3"]
        assert same(box.corners, car())
        assert (kind(box.category), box.track_id) == ("vehicle", "abc")

    def test_camel_case_without_zeros(self, tmp_path: Path) -> None:
        box = {"centerX": 16.5, "length": 4.5, "width": 2.0, "height": 1.6}
        frame = {"timestampMicros": "1550083467346370", "laserLabels": [{"box": box, "type": "TYPE_VEHICLE"}]}
        (found,) = read_waymo(write(tmp_path / "f.json", [frame]), self.EXTRINSIC)["1550083467346370"]
        assert found.corners.mean(axis=0) == pytest.approx((0.1, 2.1, 15))
        assert np.ptp(found.corners, axis=0) == pytest.approx((2.0, 1.6, 4.5))  # it faces along the camera's z

    @pytest.mark.parametrize(
        ("label", "message"),
        [
            ({"type": 1}, "'box'"),
            ({"box": BOX, "type": 9}, "type: expected a name"),
            ({"box": {"length": 1}, "type": 1}, "'width'"),
            ({"box": 3, "type": 1}, "expected a label"),
        ],
    )
    def test_malformed_label_is_named(self, tmp_path: Path, label: dict[str, Any], message: str) -> None:
        path = write(tmp_path / "f.json", [{"frame": 0, "laser_labels": [label]}])
        with pytest.raises(MetricError, match=rf"f\.json: frame 0, label 0: .*{message}"):
            read_waymo(path, self.EXTRINSIC)

    def test_frame_without_name(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match=r"frame 0: .*'timestamp_micros'"):
            read_waymo(write(tmp_path / "f.json", [{"laser_labels": []}]), self.EXTRINSIC)

    def test_extrinsic(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match="pose: expected"):
            read_waymo(write(tmp_path / "f.json", []), np.zeros((4, 4)))


class TestLayers:
    def box(self, camera_to_world: Array) -> Box:
        # x forward, y up, z right
        forward, up = np.array([np.cos(YAW), 0, -np.sin(YAW)]), np.array([0.0, -1, 0])
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([forward, up, np.cross(forward, up)])
        pose[:3, 3] = CENTRE
        return Box(track_id=4, category="Car", object_to_world=camera_to_world @ pose, size=(LENGTH, HEIGHT, WIDTH))

    def test_reads_what_rendering_writes(self, tmp_path: Path) -> None:
        pose = random_pose(2)
        path = write(tmp_path / "boxes.json", {"5": [self.box(pose).to_json()], "6": []})
        boxes = read_layers(path, {"5": pose, "6": pose})
        assert same(boxes["5"][0].corners, car())
        assert (boxes["5"][0].track_id, "6" in boxes) == ("4", False)

    def test_boxes_of_a_clip(self) -> None:
        frames = {"0": [self.box(np.eye(4)).to_json()]}
        assert same(boxes_of_layers(frames, {"0": np.eye(4)}, Path("clip"))["0"][0].corners, car())

    def test_malformed_box_is_named(self, tmp_path: Path) -> None:
        path = write(tmp_path / "boxes.json", {"5": [{"track_id": 1}]})
        with pytest.raises(MetricError, match=r"boxes\.json: frame 5, box 0: .*'object_to_world'"):
            read_layers(path, {"5": np.eye(4)})
        with pytest.raises(MetricError, match="an object of lists"):
            read_layers(write(tmp_path / "boxes.json", []), {})


class TestFiles:
    def test_absent(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match=r"none\.json: expected a text file"):
            read_ovmono3d(tmp_path / "none.json")

    @pytest.mark.parametrize("text", ["", "[", "[NaN]", '{"a": Infinity}'])
    def test_not_strict_json(self, tmp_path: Path, text: str) -> None:
        with pytest.raises(MetricError, match=r"r\.json: expected (strict )?JSON"):
            read_ovmono3d(write(tmp_path / "r.json", text))

    def test_binary(self, tmp_path: Path) -> None:
        path = tmp_path / "r.json"
        path.write_bytes(b"\xff\xfe\x00\x80")
        with pytest.raises(MetricError, match="text file that can be read"):
            read_ovmono3d(path)


def test_a_box_compares_with_itself_in_every_format(tmp_path: Path) -> None:
    """The files above describe one car, so its rectangle is one, too."""
    camera = Camera(K=np.array([[1000.0, 0, 640], [0, 1000, 352], [0, 0, 1]]), width=1280, height=704)
    kitti = read_kitti_tracking(write(tmp_path / "k.txt", f"7 1 {TestKITTI.FIELDS}\n"), camera.K)["7"][0]
    ovmono3d = read_ovmono3d(write(tmp_path / "o.json", [TestOVMono3D().result()]))["7"][0]
    waymo_file = [{"frame": 7, "laser_labels": [{"box": TestWaymo.BOX, "type": 1}]}]
    waymo = read_waymo(write(tmp_path / "w.json", waymo_file), TestWaymo.EXTRINSIC)["7"][0]
    own = Box3D(corners=car(), category="car")
    for box in (kitti, ovmono3d, waymo):
        a, b = visible(box.corners, camera), visible(own.corners, camera)
        assert isinstance(a, Rectangle)
        assert isinstance(b, Rectangle)
        assert iou(a, b) == pytest.approx(1)


class TestAnyKind:
    """A file says itself of which kind it is, and what it lacks is asked for by the option that gives it."""

    def ovmono3d(self, folder: Path) -> Path:
        return write(folder / "o.json", [TestOVMono3D().result()])

    def tracking(self, folder: Path) -> Path:
        return write(folder / "k.txt", f"7 1 {TestKITTI.FIELDS}\n")

    def frames(self, folder: Path) -> Path:
        (folder / "label_2").mkdir()
        return write(folder / "label_2" / "000007.txt", f"{TestKITTI.FIELDS}\n").parent

    def nuscenes(self, folder: Path) -> Path:
        return write(folder / "n.json", {"results": {"7": [TestNuScenes().item(np.eye(4))]}})

    def layers(self, folder: Path) -> Path:
        return write(folder / "l.json", {"7": [TestLayers().box(np.eye(4)).to_json()]})

    def waymo(self, folder: Path) -> Path:
        return write(folder / "w.json", [{"frame": 7, "laserLabels": [{"box": TestWaymo.BOX, "type": 1}]}])

    @pytest.mark.parametrize("kind_of_file", ["ovmono3d", "tracking", "frames", "nuscenes", "layers", "waymo"])
    def test_one_car(self, tmp_path: Path, kind_of_file: str) -> None:
        found = read_boxes(
            getattr(self, kind_of_file)(tmp_path),
            projection=np.eye(3),
            extrinsic=TestWaymo.EXTRINSIC,
            camera_to_world={"7": np.eye(4)},
            categories={2: "car"},
        )
        (box,) = found["7"]
        assert same(box.corners, car())
        assert kind(box.category) == "vehicle"

    @pytest.mark.parametrize(
        ("kind_of_file", "option"),
        [("tracking", "--calib"), ("frames", "--calib"), ("layers", "--clip"), ("waymo", "--camera")],
    )
    def test_what_is_missing_is_asked_for(self, tmp_path: Path, kind_of_file: str, option: str) -> None:
        with pytest.raises(MissingError, match=f"^{option}: "):
            read_boxes(getattr(self, kind_of_file)(tmp_path))

    def test_what_is_not_needed_is_not_asked_for(self, tmp_path: Path) -> None:
        assert same(read_boxes(self.nuscenes(tmp_path))["7"][0].corners, car())
        assert read_boxes(self.ovmono3d(tmp_path))["7"][0].category == "2"
        assert read_boxes(write(tmp_path / "empty.json", [])) == {}

    def test_a_byte_order_mark_is_no_part_of_json(self, tmp_path: Path) -> None:
        path = self.ovmono3d(tmp_path)
        path.write_text(path.read_text(encoding="utf-8"), encoding="utf-8-sig")
        assert list(read_boxes(path)) == ["7"]

    @pytest.mark.parametrize("text", ["{", "[NaN]", "3"])
    def test_no_boxes(self, tmp_path: Path, text: str) -> None:
        with pytest.raises(MetricError, match=r"r\.json: expected"):
            read_boxes(write(tmp_path / "r.json", text))

    def test_a_folder_of_something_else(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match=r"KITTI labels \*\.txt, got a folder without"):
            read_boxes(tmp_path)
