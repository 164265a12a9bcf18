"""Single linkage: the same partition as the whole graph of distances, of any shape, density and place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from aw4d.errors import InputError
from aw4d.lights.clusters import components

Points = NDArray[np.float64]
N = 2000


def _by_all_distances(points: Points, distance: float) -> NDArray[np.int32]:
    p = points - points.min(axis=0)
    square = sum((p[:, None, axis] - p[None, :, axis]) ** 2 for axis in range(3))
    return np.asarray(connected_components(csr_array(square < distance**2), directed=False)[1])


def _check(points: Points, distance: float = 0.5) -> None:
    found, expected = components(points, distance), _by_all_distances(points, distance)
    pairs = np.unique(np.stack([found, expected]), axis=1)
    assert pairs.shape[1] == found.max() + 1 == expected.max() + 1
    first = np.unique(found, return_index=True)[1]
    assert (np.diff(first) > 0).all(), "numbered in order of first appearance"


def _sets() -> dict[str, Points]:
    rng = np.random.default_rng(0)
    lattice = np.stack(np.meshgrid(*[np.arange(12) * 0.5] * 3), -1).reshape(-1, 3)
    plane = rng.uniform(0, 6, (N, 2))
    walls = np.concatenate([plane, 0.505 * rng.integers(2, size=(N, 1)) + 0.01 * rng.random((N, 1))], axis=1)
    lamps = rng.uniform(-20, 20, (30, 3))[rng.integers(30, size=N)] + rng.normal(0, 0.2, (N, 3))
    return {
        "exactly the distance apart": rng.permutation(lattice),
        "a hair nearer": rng.permutation(lattice * (1 - 1e-12)),
        "walls": walls,
        "lamps": lamps,
        "line": np.cumsum(rng.uniform(0, 0.6, N))[:, None] * np.array([[0.6, 0, 0.8]]),
        "diagonal line": np.cumsum(rng.uniform(0, 0.6, N))[:, None] * np.ones((1, 3)),
        "duplicates": rng.permutation(np.repeat(rng.uniform(0, 4, (N // 10, 3)), 10, axis=0)),
        "one spot": rng.normal(0, 1e-9, (N, 3)),
        "far apart": rng.uniform(-1e7, 1e7, (N, 3)),
        **{f"uniform, {side} m": rng.uniform(-side / 2, side / 2, (N, 3)) for side in (2.0, 4, 6, 7, 8, 12)},
    }


@pytest.mark.parametrize("name", _sets())
@pytest.mark.parametrize("origin", [(0, 0, 0), (5e5, 120, -4e6)], ids=["near", "UTM"])
def test_the_partition_of_all_distances(name: str, origin: tuple[float, float, float]) -> None:
    _check(_sets()[name] + origin)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-12, 12)] * 3), min_size=1, max_size=60), st.sampled_from([0.25, 0.5, 1.0]))
def test_points_on_a_lattice(cells: list[tuple[int, int, int]], distance: float) -> None:
    _check(np.array(cells, dtype=np.float64) / 8, distance)


def test_well_filled_cells_are_linked_by_their_closest_points() -> None:
    rng = np.random.default_rng(1)
    ball = rng.uniform(-0.14, 0.14, (N // 2, 3))
    for gap in (0.4999, 0.5, 0.5001):
        other = ball + np.array([np.ptp(ball[:, 0]) + gap, 0, 0])
        # Mirrored, so that the ends that face each other are the same point.
        other[:, 0] = other[:, 0].max() + other[:, 0].min() - other[:, 0]
        _check(np.concatenate([ball, other]))


def test_none_and_one() -> None:
    assert components(np.zeros((0, 3)), 0.5).shape == (0,)
    assert components(np.full((1, 3), 1e7), 0.5).tolist() == [0]


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.zeros(3), np.full((2, 3), np.nan)])
def test_what_is_no_points_is_refused(points: Points) -> None:
    with pytest.raises(InputError, match="points: expected finite"):
        components(points, 0.5)


def test_the_distance_is_positive() -> None:
    with pytest.raises(InputError, match="distance"):
        components(np.zeros((3, 3)), 0.0)
