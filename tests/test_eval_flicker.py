"""Flicker: exact scenes that a camera drives through, and what is put into their pictures on purpose."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.flicker import Change, Flicker, shared, static_variance
from eval.score import Score
from eval.values import Undefined
from eval.view import View

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
HEIGHT, WIDTH = 96, 160
K = np.array([[120.0, 0, 79.5], [0, 120.0, 47.5], [0, 0, 1]])
NOTHING = np.zeros((HEIGHT, WIDTH), np.bool_)
METRIC = Flicker()


def pose(x: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Array:
    """Camera to world: shifted to the right and ahead [m] and turned about the vertical [rad]."""
    out = np.eye(4)
    out[:3, :3] = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    out[:3, 3] = (x, 0, z)
    return out


def view_of(depth: Array, camera_to_world: Array, moving: NDArray[np.bool_] = NOTHING) -> View:
    """A view without sky."""
    return View(depth=depth, K=K, camera_to_world=camera_to_world, sky=NOTHING, moving=moving)


def room(camera_to_world: Array) -> tuple[Picture, View]:
    """A wall 30 m ahead and a floor 1.5 m below with a smooth pattern, as the camera sees them; exact."""
    still = view_of(np.ones((HEIGHT, WIDTH)), camera_to_world)
    ray = still.rays() @ camera_to_world[:3, :3].T
    eye = camera_to_world[:3, 3]
    wall = (30 - eye[2]) / ray[..., 2]
    floor = np.where(ray[..., 1] > 0, 1.5 / np.maximum(ray[..., 1], 1e-9), np.inf)
    depth = np.minimum(wall, floor)
    x, y, z = np.moveaxis(eye + ray * depth[..., None], -1, 0)
    shade = 120 + 40 * np.sin(x / 2) * np.cos(z / 3) + 30 * np.sin(y + x / 5)
    colour = shade[..., None] + np.array([0.0, 8.0, -8.0])
    return np.rint(colour).astype(np.uint8), view_of(depth, camera_to_world)


def drive(count: int = 6) -> tuple[list[Picture], list[View]]:
    """A drive ahead with a turn."""
    frames = [room(pose(x=0.05 * i, z=0.8 * i, yaw=0.01 * i)) for i in range(count)]
    return [picture for picture, _ in frames], [view for _, view in frames]


def score(ref: list[Picture], gen: list[Picture], views: list[View]) -> Score:
    """Flicker of a video."""
    pairs = range(1, len(views))
    return METRIC.pool(
        [METRIC.frame((ref[i - 1], ref[i]), (gen[i - 1], gen[i]), (views[i - 1], views[i])) for i in pairs]
    )


def test_a_scene_that_stands_still_does_not_flicker() -> None:
    picture, view = room(pose())
    found = score([picture] * 4, [picture] * 4, [view] * 4)
    assert found.value == 0
    assert found.frames == (0, 0, 0)
    assert found.others["edit over source"] == Undefined("the source does not change")
    assert found.others["share of pixels"] == 1


def test_the_motion_of_the_camera_is_taken_out() -> None:
    pictures, views = drive()
    found = score(pictures, pictures, views)
    assert isinstance(found.value, float)
    assert found.value < 0.6  # rounding to codes, twice, leaves a third of a code, and interpolation some more
    unmoved = np.mean([np.abs(a.astype(int) - b).mean() for a, b in pairwise(pictures)])
    assert found.value < unmoved / 10
    assert found.others["edit over source"] == pytest.approx(1)
    share = found.others["share of pixels"]
    assert isinstance(share, float)
    assert 0.6 < share < 1


def test_what_is_put_in_is_found() -> None:
    pictures, views = drive()
    blinking = [picture + np.uint8(20 * (i % 2)) for i, picture in enumerate(pictures)]
    found = score(pictures, blinking, views)
    assert found.value == pytest.approx(20, abs=0.2)
    assert all(value == pytest.approx(20, abs=0.2) for value in found.frames)


def test_frames_in_another_order_are_worse() -> None:
    pictures, views = drive()
    in_order = score(pictures, pictures, views)
    shuffled = score(pictures, [pictures[i] for i in (3, 0, 5, 1, 4, 2)], views)
    assert isinstance(in_order.value, float)
    assert isinstance(shuffled.value, float)
    assert shuffled.value > 5 * in_order.value


def test_what_only_one_frame_sees_is_left_out() -> None:
    pillar = np.full((HEIGHT, WIDTH), 20.0)
    columns = np.arange(WIDTH)
    before_pillar, now_pillar = (abs(columns - (79.5 + shift)) < 10 for shift in (0.0, -24.0))
    before, now = (
        view_of(np.where(is_pillar, 5.0, pillar), pose(x=x))
        for is_pillar, x in ((before_pillar, 0.0), (now_pillar, 1.0))
    )
    # A metre to the right shifts the pillar by 120 / 5 = 24 px to the left and the wall by 6 px.
    _, seen = shared(now, before, agreement=0.02)
    hidden_before = np.isin(columns + 6, columns[before_pillar]) & ~now_pillar
    assert not seen[:, hidden_before].any()
    assert seen[:, now_pillar].all()
    clear = ~now_pillar & ~hidden_before & (columns + 6 < WIDTH)
    edge = np.convolve(before_pillar | np.roll(before_pillar, -6) | now_pillar, np.ones(5), "same") > 0
    assert seen[:, clear & ~edge].all()


def test_sky_and_what_moves_are_left_out_in_both_frames() -> None:
    picture, view = room(pose())
    left, right = NOTHING.copy(), NOTHING.copy()
    left[:, :40], right[:, 120:] = True, True
    before = view_of(np.array(view.depth), pose(), moving=left)
    now = View(depth=view.depth, K=K, sky=right, moving=NOTHING)
    changed = np.where((left | right)[..., None], 0, picture).astype(np.uint8)
    record = METRIC.frame((picture, picture), (picture, changed), (before, now))
    assert record == Change(0, 0, HEIGHT * 80, HEIGHT * WIDTH)


def test_nothing_in_common_is_undefined() -> None:
    (picture, view), (_, behind) = room(pose()), room(pose())
    turned = view_of(np.array(behind.depth), pose(yaw=np.pi))
    found = score([picture] * 2, [picture] * 2, [view, turned])
    assert found.value == Undefined("no surface is seen in both frames")
    assert found.others["share of pixels"] == 0


def test_one_frame_has_nothing_to_differ_from() -> None:
    assert METRIC.pool([]).value == Undefined("one frame only")


def test_pairs_count_by_their_pixels() -> None:
    found = METRIC.pool([Change(100, 200, 100, 400), Change(0, 0, 300, 400), Change(0, 0, 0, 400)])
    assert found.value == 0.5
    assert found.frames == (2, 0, Undefined("no surface is seen in both frames"))
    assert found.others == {"source": 0.25, "edit over source": 2, "share of pixels": 400 / 1200}


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 9))
def test_static_variance_is_that_of_numpy(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    pictures = rng.integers(200, 256, (count, HEIGHT, WIDTH, 3), dtype=np.uint8)
    _, view = room(pose())
    expected = pictures.astype(np.float64).var(axis=0).mean()
    assert static_variance(iter(pictures), [view] * count).value == pytest.approx(expected, rel=1e-12)


def test_static_variance_of_an_even_picture_is_exactly_0_and_of_two_levels_known() -> None:
    _, view = room(pose())
    even, other = (np.full((HEIGHT, WIDTH, 3), level, np.uint8) for level in (251, 241))
    assert static_variance([even] * 7, [view] * 7).value == 0
    assert static_variance([even, other] * 3, [view] * 6).value == 25


def test_static_variance_looks_at_what_is_still_in_every_frame() -> None:
    _, view = room(pose())
    moving = NOTHING.copy()
    moving[:, :80] = True
    dark, bright = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    bright[:, :80] = 255
    views = [view, view_of(np.array(view.depth), pose(), moving=moving)]
    found = static_variance([dark, bright], views)
    assert found.value == 0
    assert found.others == {"share of pixels": 0.5, "frames": 2}


def test_static_variance_needs_a_camera_that_stands_still_and_two_frames() -> None:
    pictures, views = drive(3)
    assert static_variance(pictures, views).value == Undefined("the camera moves")
    assert static_variance(pictures[:1], views[:1]).value == Undefined("one frame only")
    turned = view_of(np.array(views[0].depth), pose(yaw=0.002))
    assert static_variance(pictures[:2], [views[0], turned]).value == Undefined("the camera moves")
    hidden = view_of(np.array(views[0].depth), pose(), moving=~NOTHING)
    assert static_variance(pictures[:2], [hidden] * 2).value == Undefined("no pixel is still")


def test_a_picture_of_another_size_or_kind_is_an_error_that_names_it() -> None:
    picture, view = room(pose())
    with pytest.raises(MetricError, match=r"flicker: gen: expected a picture of the depth's size \(96, 160\)"):
        METRIC.frame((picture, picture), (picture, picture[1:]), (view, view))
    with pytest.raises(MetricError, match=r"flicker: ref: expected a picture \(H, W, 3\) uint8, got .* float64"):
        METRIC.frame((picture / 255, picture), (picture, picture), (view, view))  # type: ignore[arg-type]
