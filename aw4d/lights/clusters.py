"""Exact single linkage of points in space: which points hang together by steps shorter than a distance.

SciPy is imported where it is used: an edit whose lamps are known needs none of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aw4d.errors import InputError

Points = NDArray[np.float64]
Index = NDArray[np.int64]

PRODUCTS = 2**21  # distances that are computed at a time
MANY = 2**14  # distances between two cells from which on a tree finds the shortest faster
# Half of the columns of cells around one that can hold points within the distance, the nearest first.
_COLUMNS = ((0, 0), (0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0), (1, 2), (1, -2), (2, 1), (2, -1), (2, 2), (2, -2))


class _Cells:
    """Points sorted into cells whose diagonal is the distance, so that all points of one cell are linked."""

    def __init__(self, points: Points, distance: float) -> None:
        # A hair smaller than distance / sqrt(3): rounding must not put two points into a cell that are not linked.
        side = distance / np.sqrt(3) * (1 - 1e-9)
        x, y, z = (_without_gaps(np.floor(axis / side).astype(np.int64)) for axis in points.T)
        self.stride = int(y.max()) + 5
        self.columns, column = np.unique(x * self.stride + y, return_inverse=True)
        self.height = int(z.max()) + 5
        keys, self.of_point = np.unique(column * self.height + z, return_inverse=True)
        self.keys = keys
        self.column, self.z = keys // self.height, keys % self.height
        self.points = points[np.argsort(self.of_point, kind="stable")]
        self.count = np.bincount(self.of_point)
        self.start = np.cumsum(self.count) - self.count
        self.low = np.minimum.reduceat(self.points, self.start)
        self.high = np.maximum.reduceat(self.points, self.start)

    def pairs(self, dx: int, dy: int) -> tuple[Index, Index]:
        """Cells, and the cells within two of their height in the column at (dx, dy) from theirs, each pair once."""
        wanted = self.columns + dx * self.stride + dy
        place = np.minimum(np.searchsorted(self.columns, wanted), len(self.columns) - 1)
        there = (self.columns[place] == wanted)[self.column]
        first = np.flatnonzero(there)
        base = place[self.column[first]] * self.height + self.z[first]
        lowest = 1 if (dx, dy) == (0, 0) else -2
        start, stop = np.searchsorted(self.keys, base + lowest), np.searchsorted(self.keys, base + 3)
        owner, second = _ranges(start, stop - start)
        return first[owner], second


def _without_gaps(cell: Index) -> Index:
    """Cell numbers with every gap wider than two cells made three, so that keys stay small; from 2 on."""
    values, place = np.unique(cell, return_inverse=True)
    return np.asarray(np.cumsum(np.minimum(np.diff(values, prepend=values[0] - 2), 3))[place], dtype=np.int64)


def _ranges(start: Index, count: Index) -> tuple[Index, Index]:
    """The numbers start .. start + count - 1 of every range, and the range that each comes from."""
    owner = np.repeat(np.arange(len(start)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return owner, start[owner] + within


def _square(difference: Points) -> Points:
    return np.asarray(np.einsum("ij,ij->i", difference, difference), dtype=np.float64)


class _Groups:
    """Groups of cells that are linked so far."""

    def __init__(self, count: int) -> None:
        self.of_cell = np.arange(count)

    def join(self, a: Index, b: Index) -> None:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        if len(a):
            n = int(self.of_cell.max()) + 1
            edges = coo_array((np.ones(len(a), np.bool_), (self.of_cell[a], self.of_cell[b])), shape=(n, n))
            self.of_cell = connected_components(edges, directed=False)[1][self.of_cell]

    def apart(self, a: Index, b: Index) -> NDArray[np.bool_]:
        return np.asarray(self.of_cell[a] != self.of_cell[b], dtype=np.bool_)


def _link_column(cells: _Cells, groups: _Groups, a: Index, b: Index, distance: float) -> None:
    """Join the pairs of cells whose closest points are nearer than the distance."""
    apart = groups.apart(a, b)
    a, b = a[apart], b[apart]
    gap = np.maximum(np.maximum(cells.low[a] - cells.high[b], cells.low[b] - cells.high[a]), 0)
    near = _square(gap) < distance**2
    a, b = a[near], b[near]
    linked = _square(cells.points[cells.start[a]] - cells.points[cells.start[b]]) < distance**2
    groups.join(a[linked], b[linked])
    # A pair of single points is settled by now.
    products = cells.count[a] * cells.count[b]
    left = np.flatnonzero(~linked & (products > 1) & groups.apart(a, b))
    left = left[np.argsort(products[left], kind="stable")]
    large = int(np.searchsorted(products[left], MANY))
    block = np.cumsum(products[left[:large]]) // PRODUCTS
    for chosen in np.split(left[:large], np.flatnonzero(np.diff(block)) + 1):
        _link_all(cells, groups, a[chosen], b[chosen], distance)
    for pair in left[large:]:
        _link_one(cells, groups, a[pair : pair + 1], b[pair : pair + 1], distance)


def _link_all(cells: _Cells, groups: _Groups, a: Index, b: Index, distance: float) -> None:
    """Join pairs of cells by all distances between their points."""
    apart = groups.apart(a, b)
    a, b = a[apart], b[apart]
    pair, number = _ranges(np.zeros(len(a), np.int64), cells.count[a] * cells.count[b])
    p = cells.points[cells.start[a][pair] + number // cells.count[b][pair]]
    q = cells.points[cells.start[b][pair] + number % cells.count[b][pair]]
    found = np.unique(pair[_square(p - q) < distance**2])
    groups.join(a[found], b[found])


def _link_one(cells: _Cells, groups: _Groups, a: Index, b: Index, distance: float) -> None:
    """Join one pair of well-filled cells by a search for its closest points."""
    from scipy.spatial import cKDTree

    if not groups.apart(a, b)[0]:
        return
    p, q = (cells.points[cells.start[c[0]] :][: cells.count[c[0]]] for c in (a, b))
    # The tree rounds in its own way: it proposes, the same formula as everywhere decides.
    _, nearest = cKDTree(q).query(p)
    if (_square(p - q[nearest]) < distance**2).any():
        groups.join(a, b)


def components(points: Points, distance: float) -> NDArray[np.int32]:
    """Label points by single linkage: two are linked if they are nearer to each other than the distance.

    Points of a cell with the distance for its diagonal are always linked; neighbouring cells are linked by their
    closest pair of points, which is sought only where they do not hang together already. So the number of pairs within
    reach, quadratic in the density, does not matter.

    Parameters
    ----------
    points
        (N, 3) [m]; N may be 0.
    distance
        Links are strictly shorter [m]; positive.

    Returns
    -------
    (N,) labels 0, 1, ... in the order in which the components first appear.

    Raises
    ------
    InputError
        The points are not finite or not (N, 3), or the distance is not positive.
    """
    p = np.asarray(points, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or not np.isfinite(p).all():
        raise InputError(f"points: expected finite (N, 3) in metres, got shape {p.shape}")
    if not (np.isfinite(distance) and distance > 0):
        raise InputError(f"distance: expected a positive number of metres, got {distance}")
    if not len(p):
        return np.zeros(0, dtype=np.int32)
    cells = _Cells(p - p.min(axis=0), distance)
    groups = _Groups(len(cells.keys))
    for dx, dy in _COLUMNS:
        _link_column(cells, groups, *cells.pairs(dx, dy), distance)
    label = groups.of_cell[cells.of_point]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int32)
    rank[np.argsort(first)] = np.arange(len(first), dtype=np.int32)
    return rank[inverse]
