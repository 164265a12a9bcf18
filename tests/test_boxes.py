"""Box: its corners, what it contains, and its way through JSON."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aw4d.boxes import Box
from aw4d.errors import InputError


def box(yaw: float = 0.0, centre: tuple[float, float, float] = (0, 0, 0), size=(4.0, 1.5, 1.8)) -> Box:
    pose = np.eye(4)
    pose[:3, :3] = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    pose[:3, 3] = centre
    return Box(track_id=3, category="Car", object_to_world=pose, size=size)


@given(st.floats(-4, 4), st.floats(-1e3, 1e3))
def test_corners_lie_on_the_surface_and_span_the_size(yaw, x):
    b = box(yaw, (x, 2, -5))
    corners = b.corners()
    assert corners.shape == (8, 3)
    np.testing.assert_allclose(np.abs(b.to_object(corners)), np.tile(np.array(b.size) / 2, (8, 1)), atol=1e-9)
    np.testing.assert_allclose(corners.mean(axis=0), (x, 2, -5), atol=1e-9)
    assert (corners[:4, 1] < corners[4:, 1]).all(), "the bottom four come first"
    np.testing.assert_allclose(corners[:4, [0, 2]], corners[4:, [0, 2]], atol=1e-9)


def test_contains_follows_the_rotation():
    points = np.array([[1.9, 0, 0], [0, 0, 1.9], [0, 0.8, 0], [np.nan, 0, 0]])
    np.testing.assert_array_equal(box(0).contains(points), [True, False, False, False])
    np.testing.assert_array_equal(box(np.pi / 2).contains(points), [False, True, False, False])


def test_contains_keeps_leading_axes_and_includes_the_surface():
    assert box().contains(np.zeros((2, 5, 3))).shape == (2, 5)
    assert box().contains(box().corners()).all()


def test_a_box_of_zero_size_contains_its_centre_alone():
    flat = box(size=(0, 0, 0))
    np.testing.assert_array_equal(flat.contains([[0, 0, 0], [1e-6, 0, 0]]), [True, False])


def test_json_gives_the_box_back_exactly():
    b = box(0.3, (1e5, 1 / 3, -7))
    again = Box.from_json(json.loads(json.dumps(b.to_json())))
    assert (again.track_id, again.category, again.size) == (b.track_id, b.category, b.size)
    np.testing.assert_array_equal(again.object_to_world, b.object_to_world)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": (4, -1, 2)}, "size"),
        ({"size": (4, np.nan, 2)}, "size"),
        ({"track_id": -1}, "track_id"),
        ({"object_to_world": np.diag([2.0, 1, 1, 1])}, "rigid"),
        ({"object_to_world": np.diag([-1.0, 1, 1, 1])}, "rigid"),
        ({"object_to_world": np.eye(3)}, r"\(4, 4\)"),
    ],
)
def test_refuses_what_is_no_box(change, message):
    good = {"track_id": 0, "category": "Car", "object_to_world": np.eye(4), "size": (4, 1, 2)}
    with pytest.raises(InputError, match=message):
        Box(**{**good, **change})


@pytest.mark.parametrize("data", [{}, {"track_id": "x", "category": "", "object_to_world": [], "size": []}])
def test_refuses_json_that_is_no_box(data):
    with pytest.raises(InputError, match="box"):
        Box.from_json(data)
