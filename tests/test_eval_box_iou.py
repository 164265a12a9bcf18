"""IoU of boxes: rectangles of what is visible against brute force, pairing, boxes without a partner."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from eval.box_iou import NEAR, PRESETS, BoxIoU, Rectangle, box_iou, iou, projected, visible
from eval.boxes import Box3D, Camera, cuboid, kind
from eval.errors import MetricError
from eval.values import Undefined

Array = NDArray[np.float64]

CAMERA = Camera(K=np.array([[1000.0, 0, 640], [0, 1000, 352], [0, 0, 1]]), width=1280, height=704)
SIDES = st.tuples(*[st.floats(-100, 100)] * 4)


def at(x: float, y: float, z: float, size: tuple[float, float, float] = (2, 1.6, 4.5)) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return cuboid(pose, size)


def box(
    x: float, z: float = 20, *, category: str = "Car", track_id: str | None = None, score: float | None = None
) -> Box3D:
    return Box3D(corners=at(x, 1, z), category=category, track_id=track_id, score=score)


BESIDE = at(2.5, 0.9, 2)  # the rear is 25 cm behind the camera


class TestBoxBehindTheCamera:
    def test_visible_part(self) -> None:
        # Its far face is at z = 4.25: left 640 + 1500 / 4.25, top 352 + 100 / 4.25; right and bottom are the picture's.
        assert visible(BESIDE, CAMERA) == pytest.approx((640 + 1500 / 4.25, 352 + 100 / 4.25, 1280, 704))

    def test_printed_formula_flips_corners(self) -> None:
        literal, truth = projected(BESIDE, CAMERA.K), visible(BESIDE, CAMERA)
        assert isinstance(literal, Rectangle)
        assert isinstance(truth, Rectangle)
        assert literal == pytest.approx((640 - 3500 / 0.25, 352 - 1700 / 0.25, 640 + 3500 / 4.25, 352 + 1700 / 4.25))
        assert iou(literal, truth) == pytest.approx(truth.area / literal.area)
        assert round(truth.area / literal.area, 3) == 0.001
        clamped = Rectangle(*np.clip(literal, 0, (1280, 704, 1280, 704)))
        assert round(truth.area / clamped.area, 3) == 0.105

    def test_wholly_behind_is_undefined(self) -> None:
        assert visible(at(0, 0, -5), CAMERA) == Undefined("box is not in the picture")
        assert isinstance(projected(at(0, 0, -5), CAMERA.K), Rectangle)

    def test_corner_in_the_camera_plane_has_no_projection(self) -> None:
        assert isinstance(projected(at(0, 0, 1, (2, 2, 2)), CAMERA.K), Undefined)


BOXES = 10_000
EVEN = np.linspace(0, 1, 400)[None, :, None]
EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])


def random_box(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Rotation, centre and size; half of the boxes are so close that many reach behind the camera."""
    reach = rng.choice([4.0, 40.0])
    centre = rng.uniform((-0.7, -0.4, -0.2), (0.7, 0.4, 1)) * reach
    return Rotation.random(rng=rng).as_matrix(), centre, rng.uniform(0.2, 5, 3)


def corners_of(rotation: Array, centre: Array, size: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, centre
    return cuboid(pose, size)


def faces_of_the_unit_cube(steps: int) -> Array:
    """Points on the surface of the cube from -1/2 to 1/2, (n, 3)."""
    ticks = np.linspace(-0.5, 0.5, steps)
    return np.array([p for p in itertools.product(ticks, repeat=3) if 0.5 in np.abs(p)])


def pixels_to_try() -> Array:
    """Every pixel of the border of the picture, and every 32nd inside, (2, n)."""
    across, down = np.arange(1281.0), np.arange(705.0)
    border = [(u, v) for u in across for v in (0.0, 704.0)] + [(u, v) for u in (0.0, 1280.0) for v in down]
    return np.array(border + list(itertools.product(across[::32], down[::32]))).T.copy()


def hit(rays: Array, rotation: Array, centre: Array, size: Array) -> NDArray[np.bool_]:
    """Which rays, (3, n), z = 1, leave the box beyond the near plane (slabs, Kay & Kajiya 1986)."""
    inverse = 1 / (rotation.T @ rays)
    middle, half = (rotation.T @ centre)[:, None] * inverse, (size / 2)[:, None] * np.abs(inverse)
    leave = (middle + half).min(axis=0)  # depths, since rays have z = 1
    return np.asarray((leave >= NEAR) & (leave >= (middle - half).max(axis=0)))


def in_picture(points: Array) -> Array:
    """Pixels, (2, m), of those points, (n, 3), that are beyond the near plane and in the picture."""
    x, y, z = points[points[:, 2] >= NEAR].T
    u, v = x / z * 1000 + 640, y / z * 1000 + 352
    inside = (u >= 0) & (u <= 1280) & (v >= 0) & (v <= 704)
    return np.stack([u[inside], v[inside]])


def edges(depths: Array, corners: Array) -> Array:
    """Points of the box's edges, (n, 3): even along them, and at given depths."""
    a, b = corners[EDGES[:, 0], None], corners[EDGES[:, 1], None]
    even = a + EVEN * (b - a)
    share = (depths[None, :, None] - a[..., 2:]) / (b - a)[..., 2:]
    points = np.concatenate([(a + share * (b - a))[..., :2], np.broadcast_to(depths[:, None], share.shape)], axis=-1)
    return np.concatenate([even.reshape(-1, 3), points[((share >= 0) & (share <= 1))[..., 0]]])


@pytest.fixture(scope="module")
def random_boxes() -> list[tuple[Array, Array, Array]]:
    rng = np.random.default_rng(7)
    return [random_box(rng) for _ in range(BOXES)]


def test_visible_rectangle_against_sampling_of_the_surface(random_boxes: list[tuple[Array, Array, Array]]) -> None:
    """Points of the surface, and pixels whose ray leaves through it, are in the rectangle and reach its sides."""
    surface, pixels, depths = faces_of_the_unit_cube(11), pixels_to_try(), NEAR * np.geomspace(1, 100, 100)
    rays = np.linalg.solve(CAMERA.K, np.vstack([pixels, np.ones(pixels.shape[1])]))
    unseen = behind = cut = 0
    for rotation, centre, size in random_boxes:
        corners = corners_of(rotation, centre, size)
        rectangle = visible(corners, CAMERA)
        points = np.concatenate([(surface * size) @ rotation.T + centre, edges(depths, corners)])
        seen = np.hstack([in_picture(points), pixels[:, hit(rays, rotation, centre, size)]])
        if isinstance(rectangle, Undefined):
            assert seen.size == 0
            unseen += 1
        elif seen.size == 0:
            assert max(rectangle.right - rectangle.left, rectangle.bottom - rectangle.top) <= 1
        else:
            slack = np.concatenate([seen.min(axis=1) - rectangle[:2], rectangle[2:] - seen.max(axis=1)])
            assert slack.min() > -1e-6
            assert slack.max() <= 1
            behind += bool((corners[:, 2] < NEAR).any())
            cut += bool({0, 1280} & {rectangle.left, rectangle.right})
    assert min(unseen, behind, cut) > BOXES / 20  # the cases that are hard are there


def test_visible_rectangle_against_linear_programs(random_boxes: list[tuple[Array, Array, Array]]) -> None:
    """The largest u of the part in the picture, by Charnes & Cooper (1962): exact, and no polygon is cut."""
    checked = 0
    for rotation, centre, size in random_boxes[:150]:
        rectangle = visible(corners_of(rotation, centre, size), CAMERA)
        # With X = P / z and s = 1 / z: the box's six half-spaces, the picture's four, and s <= 1 / NEAR.
        box_sides = np.concatenate([rotation.T, -rotation.T])
        limits = np.concatenate([size / 2, size / 2]) + box_sides @ centre
        A = np.column_stack([box_sides[:, :2], -limits])
        bounds = [(-0.64, 0.64), (-0.352, 0.352), (0, 1 / NEAR)]
        found = [
            linprog(cost, A, -box_sides[:, 2], bounds=bounds) for cost in ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0))
        ]
        if isinstance(rectangle, Undefined):
            assert not any(result.success for result in found)
        else:
            u0, v0, u1, v1 = (result.fun * 1000 for result in found)
            assert rectangle == pytest.approx((640 + u0, 352 + v0, 640 - u1, 352 - v1), abs=1e-5)
            checked += 1
    assert checked > 50


def test_box_about_the_camera_fills_the_picture() -> None:
    assert visible(at(0, 0, 0, (20, 20, 20)), CAMERA) == pytest.approx((0, 0, 1280, 704))


def test_side_that_widens_only_out_of_the_picture_does_not_count() -> None:
    """A plank that crosses a corner of the picture: clamping its projected rectangle would give the whole picture."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", -45, degrees=True).as_matrix()
    pose[:3, 3] = 5.2, 4.4, 10  # in the middle of the plank u + v = 640 + 352 + 960
    assert visible(cuboid(pose, (40, 0.02, 0.02)), CAMERA) == pytest.approx((1248, 672, 1280, 704), abs=3)


class TestInsideThePicture:
    def test_both_conventions_agree(self) -> None:
        corners = at(1, 1, 20)
        assert visible(corners, CAMERA) == pytest.approx(projected(corners, CAMERA.K))

    def test_projection_equals_opencv(self) -> None:
        import cv2

        rng = np.random.default_rng(1)
        corners = corners_of(Rotation.random(rng=rng).as_matrix(), np.array([1.0, -1, 15]), np.array([2.0, 1, 4]))
        pixels = cv2.projectPoints(corners, np.zeros(3), np.zeros(3), CAMERA.K, None)[0][:, 0]
        assert projected(corners, CAMERA.K) == pytest.approx((*pixels.min(axis=0), *pixels.max(axis=0)))

    def test_flat_on_edge_has_no_area(self) -> None:
        corners = np.array([(x, 0.0, z) for z in (5, 9) for x in (-1, 1, 1, -1)])
        assert isinstance(visible(corners, CAMERA), Undefined)


class TestIoU:
    def test_by_hand(self) -> None:
        assert iou(Rectangle(0, 0, 10, 10), Rectangle(5, 5, 15, 15)) == pytest.approx(25 / 175)

    def test_apart_and_equal(self) -> None:
        assert iou(Rectangle(0, 0, 1, 1), Rectangle(2, 2, 3, 3)) == 0
        assert iou(Rectangle(0, 0, 1, 1), Rectangle(0, 0, 1, 1)) == 1

    def test_no_area(self) -> None:
        assert isinstance(iou(Rectangle(1, 1, 1, 1), Rectangle(1, 1, 1, 1)), Undefined)

    @settings(deadline=None)
    @given(SIDES, SIDES)
    def test_symmetric_and_at_most_one(self, a: tuple[float, ...], b: tuple[float, ...]) -> None:
        first, second = Rectangle(*a), Rectangle(*b)
        value = iou(first, second)
        assert value == iou(second, first)
        assert isinstance(value, Undefined) or 0 <= value <= 1


class TestPairing:
    def test_same_boxes_give_one(self) -> None:
        boxes = {"0": (box(-4), box(2), box(30, category="Van"))}
        score = box_iou(boxes, boxes, {"0": CAMERA})
        assert score.value == 1
        assert score.frames == (1.0,)
        assert score.others["boxes not in the picture"] == 2  # the van, on both sides

    def test_largest_sum_not_greedy(self) -> None:
        # b touches both; greedy gives b to the nearer and leaves a's neighbour alone.
        ref, gen = (box(0), box(1.2)), (box(0.55), box(-1.0))
        match = BoxIoU().match(ref, gen, CAMERA)
        assert len(match.ious) == 2

    def test_without_partner_counts_zero_and_is_counted(self) -> None:
        score = box_iou({"0": (box(-4), box(4))}, {"0": (box(-4), box(0))}, {"0": CAMERA})
        assert score.value == pytest.approx(1 / 3)
        assert score.others["mean over pairs"] == 1
        assert (score.others["pairs"], score.others["missed boxes"], score.others["extra boxes"]) == (1, 1, 1)

    def test_frame_without_detections_is_missed_not_dropped(self) -> None:
        score = box_iou({"0": (box(0),), "1": (box(0),)}, {"0": (box(0),)}, {"0": CAMERA, "1": CAMERA})
        assert score.value == 0.5
        assert score.frames == (1.0, 0.0)

    def test_frame_without_boxes_is_undefined(self) -> None:
        score = box_iou({"0": (box(0),)}, {"0": (box(0),)}, {"0": CAMERA, "1": CAMERA})
        assert score.frames == (1.0, Undefined("no box in the picture"))
        assert score.value == 1

    def test_interval_by_drawing_frames_anew(self) -> None:
        ref = {str(frame): (box(0),) for frame in range(20)}
        gen = {frame: boxes for frame, boxes in ref.items() if int(frame) % 2}
        score = box_iou(ref, gen, dict.fromkeys(ref, CAMERA))
        assert score.value == 0.5
        assert score.interval is not None
        assert score.interval[0] < 0.5 < score.interval[1]

    def test_nothing_at_all_is_undefined(self) -> None:
        assert box_iou({}, {}, {"0": CAMERA}).value == Undefined("no box in the picture")

    def test_identities_pair_where_both_sides_have_them(self) -> None:
        ref = (box(-4, track_id="1"), box(4, track_id="2"))
        gen = (box(-4, track_id="2"), box(4, track_id="1"))
        assert BoxIoU().match(ref, gen, CAMERA).ious == (0.0, 0.0)
        assert BoxIoU(pairing="iou").match(ref, gen, CAMERA).ious == (1.0, 1.0)

    def test_one_side_without_identities_pairs_by_iou(self) -> None:
        assert BoxIoU().match((box(1, track_id="1"),), (box(1),), CAMERA).ious == (1.0,)

    def test_identities_that_are_needed(self) -> None:
        with pytest.raises(MetricError, match=r"expected identities.*None"):
            BoxIoU(pairing="id").match((box(1, track_id="1"),), (box(1),), CAMERA)
        with pytest.raises(MetricError, match="each once"):
            BoxIoU().match((box(1, track_id="1"), box(4, track_id="1")), (), CAMERA)

    def test_kinds_do_not_mix(self) -> None:
        match = BoxIoU().match((box(0, category="Car"),), (box(0, category="Pedestrian"),), CAMERA)
        assert (match.ious, match.missed, match.extra) == ((), 1, 1)

    def test_vehicles_of_all_data_sets_pair(self) -> None:
        ref = (box(0, category="TYPE_VEHICLE"), box(5, category="TYPE_SIGN"))
        match = PRESETS["paper"].match(ref, (box(0, category="car"),), CAMERA)
        assert (match.ious, match.missed) == ((1.0,), 0)

    def test_one_side_not_in_the_picture_leaves_the_other_alone(self) -> None:
        match = BoxIoU().match((box(0, track_id="1"),), (box(0, z=-20, track_id="1"),), CAMERA)
        assert (match.ious, match.missed, match.extra, match.unseen) == ((), 1, 0, 1)

    def test_boxes_of_a_frame_that_is_not_compared(self) -> None:
        with pytest.raises(MetricError, match=r"generated: expected frames 0, got boxes of 1 others: 10"):
            box_iou({"0": (box(0),)}, {"10": (box(0),)}, {"0": CAMERA})

    def test_frames_restrict_both_sides_and_the_cameras(self) -> None:
        ref = {"0": (box(0),), "1": (box(0),), "7": (box(0),)}
        gen = {"0": (box(-9),), "1": (box(0),), "9": (box(0),)}
        score = box_iou(ref, gen, dict.fromkeys("012", CAMERA), frames=["1", "2"])
        assert score.frames == (1.0, Undefined("no box in the picture"))
        with pytest.raises(MetricError, match="got boxes of 1 others: 7"):
            box_iou(ref, {}, dict.fromkeys("012", CAMERA), frames=["1", "7"])


class TestLeastScore:
    SURE, UNSURE, LABEL = box(0, score=0.9), box(6, score=0.2), box(-6)

    def test_detections_under_it_are_left_out_and_counted(self) -> None:
        boxes = {"0": (self.SURE, self.UNSURE, self.LABEL)}
        score = box_iou(boxes, {"0": (self.SURE, self.LABEL)}, {"0": CAMERA}, BoxIoU(min_score=0.5))
        assert score.value == 1
        assert score.others["boxes under the least score"] == 1
        assert score.others["missed boxes"] == 0

    def test_without_it_all_stay(self) -> None:
        boxes = {"0": (self.SURE, box(6, score=-3.0))}
        score = box_iou(boxes, boxes, {"0": CAMERA})
        assert (score.others["pairs"], score.others["boxes under the least score"]) == (2, 0)


class TestCategoriesByNumber:
    """A number is no kind, and no name: to compare it with one would find nothing, and say 0."""

    NUMBERED, NAMED = {"0": (box(0, category="2"), box(5, category="-1"))}, {"0": (box(0, category="Car"),)}

    def test_vehicles_are_asked_for(self) -> None:
        with pytest.raises(MetricError, match=r"reference: expected .* vehicle, got numbers: -1, 2 \(--categories"):
            box_iou(self.NUMBERED, self.NUMBERED, {"0": CAMERA}, PRESETS["paper"])

    def test_the_other_side_has_names(self) -> None:
        with pytest.raises(MetricError, match=r"generated: expected categories by name.*--categories"):
            box_iou(self.NAMED, self.NUMBERED, {"0": CAMERA})

    def test_numbers_on_both_sides_are_compared(self) -> None:
        assert box_iou(self.NUMBERED, self.NUMBERED, {"0": CAMERA}).value == 1

    def test_identities_need_no_names(self) -> None:
        ref, gen = (({"0": (box(0, category=name, track_id="1"),)}) for name in ("Car", "2"))
        assert box_iou(ref, gen, {"0": CAMERA}, BoxIoU(pairing="id")).value == 1


class TestBroken:
    def test_corners_of_another_order(self) -> None:
        shuffled = at(0, 0, 10)[[0, 2, 1, 3, 4, 6, 5, 7]]
        with pytest.raises(MetricError, match="ring of four"):
            Box3D(corners=shuffled, category="Car")

    @pytest.mark.parametrize("corners", [np.zeros((4, 3)), np.full((8, 3), np.nan)])
    def test_corners(self, corners: Array) -> None:
        with pytest.raises(MetricError, match=r"corners: expected \(8, 3\) finite"):
            Box3D(corners=corners, category="Car")

    def test_size(self) -> None:
        with pytest.raises(MetricError, match="three positive lengths"):
            cuboid(np.eye(4), (1, -1, 1))

    def test_pose(self) -> None:
        with pytest.raises(MetricError, match="rigid"):
            cuboid(2 * np.eye(4), (1, 1, 1))

    def test_camera(self) -> None:
        with pytest.raises(MetricError, match="K: expected"):
            Camera(K=np.zeros((3, 3)), width=10, height=10)
        with pytest.raises(MetricError, match="at least 1x1"):
            Camera(K=CAMERA.K, width=0, height=10)


def test_kinds() -> None:
    assert {kind(name) for name in ("Van", "tram", "human.pedestrian.adult", "Misc")} == {
        "vehicle",
        "pedestrian",
        "misc",
    }
