"""Shapes that a ray is intersected with: convex solids, house fronts with openings, leafy shells.

A ray is origin + t * direction. A bundle has one origin and many directions (the eye) or many origins and one
direction (the sun); the part that is common stays a number, which halves the work.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from aw4d.street.noise import cell, cell_value3

Array = NDArray[Any]
Vector = tuple[Any, Any, Any]  # three components, each a number or an array
Point = tuple[float, float, float]

_TINY = 1e-200  # a divisor that stands for zero

# Faces of a solid are numbered as its planes, then its quadrics; these lie behind the plane of a house front.
GLASS, REVEAL_LEFT, REVEAL_RIGHT, REVEAL_BOTTOM, REVEAL_TOP = range(100, 105)


@dataclass(frozen=True)
class Rays:
    """A bundle of rays: components of the origins [m] and of the directions."""

    origin: Vector
    direction: Vector

    def take(self, index: Array) -> Rays:
        """The rays with the given numbers."""
        return Rays(_take(self.origin, index), _take(self.direction, index))

    def at(self, t: Array) -> Vector:
        """Points at the given parameters."""
        o, d = self.origin, self.direction
        return o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]


class Shape(Protocol):
    """What the renderer asks of a shape."""

    @property
    def bounds(self) -> tuple[Point, Point]:
        """Corners of an axis-aligned box that holds the shape [m]."""

    def hit(self, rays: Rays) -> tuple[Array, Array]:
        """Smallest positive t on each ray (infinite: none) and the number of the face that is met."""

    def blocks(self, rays: Rays) -> Array:
        """Whether a ray meets the shape at any positive t."""

    def normal(self, points: Vector, face: Array) -> Array:
        """Outward unit normals at surface points, (3, N)."""


def _take(vector: Vector, index: Array) -> Vector:
    x, y, z = (c[index] if isinstance(c, np.ndarray) else c for c in vector)
    return x, y, z


def _dot(n: Point, v: Vector) -> Any:
    """Dot product that leaves out the zeros of n: most planes are axis-aligned."""
    terms = [c * x for c, x in zip(n, v, strict=True) if c != 0]
    return sum(terms[1:], start=terms[0])


def _half_space(gap: Any, speed: Any) -> tuple[Any, Any]:
    """Where rays enter and leave a half-space, given the distance that is left to its plane and its loss per unit of t.

    One of the two is a common number of the bundle. None says that no ray of it enters (leaves). A ray that runs along
    the plane is inside for ever or never: the tiny divisor takes its t to a huge number.
    """
    if np.ndim(speed) == 0:
        if speed < 0:
            return gap / speed, None
        if speed > 0:
            return None, gap / speed
        return np.where(gap < 0, np.inf, -np.inf), None
    if gap < 0:
        return gap / np.minimum(speed, -_TINY), None
    return None, gap / np.maximum(speed, _TINY)


@dataclass(frozen=True)
class Quadric:
    """Convex quadric |M (p - centre)|^2 <= 1: an ellipsoid (three rows in M) or an endless cylinder (two)."""

    centre: Point
    rows: tuple[Point, ...]

    def roots(self, rays: Rays) -> tuple[Array, Array]:
        """Entry and exit on each ray; infinities in the wrong order where the ray misses."""
        shifted = tuple(o - c for o, c in zip(rays.origin, self.centre, strict=True))
        a: Any = 0.0
        b: Any = 0.0
        c: Any = -1.0
        for row in self.rows:
            start, step = _dot(row, (shifted[0], shifted[1], shifted[2])), _dot(row, rays.direction)
            a, b, c = a + step * step, b + start * step, c + start * start
        disc = b * b - a * c
        met = disc > 0
        root = np.sqrt(np.where(met, disc, 0))
        a = np.maximum(a, 1e-300)
        return np.where(met, (-b - root) / a, np.inf), np.where(met, (-b + root) / a, -np.inf)

    def gradient(self, points: Vector) -> Array:
        """Outward unit normals, (3, N)."""
        shifted = (points[0] - self.centre[0], points[1] - self.centre[1], points[2] - self.centre[2])
        g = np.zeros((3, np.size(points[0])))
        for row in self.rows:
            along = _dot(row, shifted)
            for axis in range(3):
                if row[axis] != 0:
                    g[axis] += row[axis] * along
        return g / np.sqrt(np.einsum("cn,cn->n", g, g))


@dataclass(frozen=True)
class Solid:
    """Convex solid: the points inside all planes (n . p <= offset) and all quadrics."""

    bounds: tuple[Point, Point]
    planes: tuple[tuple[Point, float], ...]
    quadrics: tuple[Quadric, ...] = ()

    def _crossings(self, rays: Rays) -> Iterator[tuple[Any, Any]]:
        """Where rays enter and leave each plane and each quadric; None where no ray of the bundle does."""
        for n, offset in self.planes:
            yield _half_space(offset - _dot(n, rays.origin), _dot(n, rays.direction))
        for quadric in self.quadrics:
            yield quadric.roots(rays)

    def interval(self, rays: Rays) -> tuple[Array, Array, Array]:
        """Entry, exit and the face entered through; entry > exit where the ray misses."""
        size = np.broadcast(*rays.origin, *rays.direction).shape
        enter, leave = np.full(size, -np.inf), np.full(size, np.inf)
        face = np.zeros(size, np.int16)
        for number, (t0, t1) in enumerate(self._crossings(rays)):
            if t0 is not None:
                later = t0 > enter
                np.copyto(enter, t0, where=later)
                np.copyto(face, number, where=later)
            if t1 is not None:
                np.minimum(leave, t1, out=leave)
        return enter, leave, face

    def hit(self, rays: Rays) -> tuple[Array, Array]:
        """See `Shape`; the ray starts outside."""
        enter, leave, face = self.interval(rays)
        return np.where((enter <= leave) & (enter > 0), enter, np.inf), face

    def blocks(self, rays: Rays) -> Array:
        """See `Shape`."""
        enter: Any = 0.0
        leave: Any = np.inf
        for t0, t1 in self._crossings(rays):
            enter = enter if t0 is None else np.maximum(enter, t0)
            leave = leave if t1 is None else np.minimum(leave, t1)
        return np.asarray(enter < leave)

    def normal(self, points: Vector, face: Array) -> Array:
        """See `Shape`."""
        table = np.array([n for n, _ in self.planes] or [(0.0, 0.0, 0.0)])
        out = table[np.minimum(face, len(table) - 1)].T.copy()
        for number, quadric in enumerate(self.quadrics, start=len(self.planes)):
            on = face == number
            if on.any():
                out[:, on] = quadric.gradient((points[0][on], points[1][on], points[2][on]))
        return out


@dataclass(frozen=True)
class Openings:
    """Windows and one door on a house front, on a grid of bays and floors.

    Parameters
    ----------
    start, base
        World x of the first bay's edge and world y of the ground floor [m].
    pitch, storey
        Width of a bay and height of a floor [m].
    bays, floors
        Size of the grid.
    width, height, sill
        A window's size and its height above the floor [m].
    door
        Bay of the door.
    recess
        How far the glass lies behind the front [m].
    """

    start: float
    base: float
    pitch: float
    storey: float
    bays: int
    floors: int
    width: float
    height: float
    sill: float
    door: int
    recess: float
    door_width: float = 1.05
    door_height: float = 2.25

    def around(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Edges (x low, high, y low, high) of the opening in each point's cell, and whether the point is in it."""
        bay = np.clip(np.floor((x - self.start) / self.pitch), 0, self.bays - 1)
        floor = np.clip(np.floor((y - self.base) / self.storey), 0, self.floors - 1)
        door = (bay == self.door) & (floor == 0)
        centre = self.start + (bay + 0.5) * self.pitch
        half = np.where(door, self.door_width, self.width) / 2
        low = self.base + floor * self.storey + np.where(door, 0.0, self.sill)
        high = low + np.where(door, self.door_height, self.height)
        inside = (np.abs(x - centre) < half) & (y > low) & (y < high)
        return centre - half, centre + half, low, high, inside


@dataclass(frozen=True)
class House(Solid):
    """Box with recessed openings in its street front, which is plane 0 and looks along z."""

    openings: Openings = field(kw_only=True)

    @property
    def _facing(self) -> float:
        return self.planes[0][0][2]

    @property
    def _front(self) -> float:
        return self.planes[0][1] * self._facing

    def hit(self, rays: Rays) -> tuple[Array, Array]:
        """See `Shape`: a ray that enters an opening goes on to the glass or to a reveal."""
        t, face = super().hit(rays)
        front = np.flatnonzero((face == 0) & np.isfinite(t))
        if front.size == 0:
            return t, face
        sub = rays.take(front)
        x, y, _ = sub.at(t[front])
        x0, x1, y0, y1, inside = self.openings.around(x, y)
        front, sub = front[inside], sub.take(inside)
        edges = (x0[inside], x1[inside], y0[inside], y1[inside])
        t[front], face[front] = self._recess(sub, edges)
        return t, face

    def _recess(self, rays: Rays, edges: tuple[Array, Array, Array, Array]) -> tuple[Array, Array]:
        """First of the glass and the four reveals, seen from within the opening."""
        (ox, oy, oz), (dx, dy, dz) = rays.origin, rays.direction
        best = (self._front - self._facing * self.openings.recess - oz) / dz
        face = np.full(best.shape, GLASS, np.int16)
        walls = ((ox, dx, -1), (ox, dx, 1), (oy, dy, -1), (oy, dy, 1))
        for number, (edge, (o, d, side)) in enumerate(zip(edges, walls, strict=True), start=REVEAL_LEFT):
            with np.errstate(divide="ignore", invalid="ignore"):
                t = np.where(d * side > 0, (edge - o) / d, np.inf)
            nearer = t < best
            np.copyto(best, t, where=nearer)
            np.copyto(face, number, where=nearer)
        return best, face

    def blocks(self, rays: Rays) -> Array:
        """See `Shape`: from inside a recess the sky is seen through the opening alone."""
        blocked = super().blocks(rays)
        depth = (self._front - rays.origin[2]) * self._facing
        within = (
            blocked & (depth >= 0) & (depth <= self.openings.recess + 1e-3) & (rays.direction[2] * self._facing > 0)
        )
        inside = np.flatnonzero(within)
        if inside.size:
            sub = rays.take(inside)
            ox, oy, oz = sub.origin
            out_x, out_y, _ = sub.at((self._front - oz) / sub.direction[2])
            x0, x1, y0, y1, _ = self.openings.around(ox, oy)
            blocked[inside] = (out_x < x0) | (out_x > x1) | (out_y < y0) | (out_y > y1)
        return blocked

    def normal(self, points: Vector, face: Array) -> Array:
        """See `Shape`; a reveal looks into its opening."""
        out = super().normal(points, np.where(face < GLASS, face, 0))
        table = {REVEAL_LEFT: (1, 0, 0), REVEAL_RIGHT: (-1, 0, 0), REVEAL_BOTTOM: (0, 1, 0), REVEAL_TOP: (0, -1, 0)}
        for number, n in table.items():
            out[:, face == number] = np.array(n, float)[:, None]
        return out


LAYERS = ((1.0, 0.70), (0.84, 0.42))  # of a clump of leaves: share of its radii, share of the layer that is cut out


@dataclass(frozen=True)
class Leaves:
    """Clump of leaves: two thin ellipsoids, one in the other, out of which a hashed lattice cuts holes.

    The outer one is sparse, so that the outline is ragged.

    Parameters
    ----------
    centre, radii
        The outer ellipsoid [m].
    leaf
        Side of a lattice cell [m].
    seed
        Number of the lattice.
    """

    centre: Point
    radii: Point
    leaf: float
    seed: int

    @property
    def bounds(self) -> tuple[Point, Point]:
        """See `Shape`."""
        (x, y, z), (a, b, c) = self.centre, self.radii
        return (x - a, y - b, z - c), (x + a, y + b, z + c)

    def _roots(self, rays: Rays) -> tuple[Array, Array]:
        """Where rays meet the layers' near sides and far sides, in order, (2, N) each; NaN where a layer is missed."""
        a: Any = 0.0
        b: Any = 0.0
        c: Any = 0.0
        for o, d, centre, radius in zip(rays.origin, rays.direction, self.centre, self.radii, strict=True):
            start, step = (o - centre) / radius, d / radius
            a, b, c = a + step * step, b + start * step, c + start * start
        middle = -b / a
        with np.errstate(invalid="ignore"):
            halves = [np.sqrt(middle * middle - (c - share * share) / a) for share, _ in LAYERS]
        outer, inner = halves
        return np.stack([middle - outer, middle - inner]), np.stack([middle + inner, middle + outer])

    def hit(self, rays: Rays) -> tuple[Array, Array]:
        """See `Shape`; the layers are met on their near sides, outer first, then on their far sides, inner first."""
        near, far = self._roots(rays)
        t = self._first_leaf(rays, near, (0, 1))
        through = np.flatnonzero(~np.isfinite(t) & (far[1] > 0))
        t[through] = self._first_leaf(rays.take(through), far[:, through], (1, 0))
        return t, np.zeros(t.shape, np.int16)

    def _first_leaf(self, rays: Rays, roots: Array, layers: tuple[int, int]) -> Array:
        """The first of two roots at which there is a leaf, (2, N) to (N,); infinite where there is none."""
        count = roots.shape[1]
        flat = roots.ravel()
        tried = np.flatnonzero(flat > 0)
        second = tried >= count
        t = flat[tried]
        points = rays.take(tried - count * second).at(t)
        gaps = np.where(second, LAYERS[layers[1]][1], LAYERS[layers[0]][1])
        leafy = leaf_value(points, self.leaf, self.seed) >= gaps
        found = np.full(flat.shape, np.inf)
        found[tried[leafy]] = t[leafy]
        return np.minimum(found[:count], found[count:])

    def blocks(self, rays: Rays) -> Array:
        """See `Shape`."""
        return np.isfinite(self.hit(rays)[0])

    def normal(self, points: Vector, face: Array) -> Array:
        """See `Shape`; the same on both layers, which are alike."""
        a, b, c = self.radii
        return Quadric(self.centre, ((1 / a, 0.0, 0.0), (0.0, 1 / b, 0.0), (0.0, 0.0, 1 / c))).gradient(points)


def leaf_value(points: Vector, leaf: float, seed: int) -> Array:
    """Number in [0, 1) of the leaf at each point: a lattice of leaves within a coarser one of sprigs.

    The lattice is turned and bent, so that its axes do not show.
    """
    x, y, z = (c.astype(np.float32) * np.float32(1 / leaf) for c in points)
    bend = np.float32(0.7) * np.sin(np.float32(0.8) * (x + y + z))
    i = cell(0.80 * x + 0.36 * y - 0.48 * z + bend)
    j = cell(-0.60 * x + 0.48 * y - 0.64 * z - bend)
    k = cell(0.80 * y + 0.60 * z + bend)
    fine = cell_value3(i, j, k, seed)
    coarse = cell_value3(i >> 2, j >> 2, k >> 2, seed + 1)
    return 0.72 * fine + 0.28 * coarse


def box(low: Point, high: Point) -> Solid:
    """Axis-aligned box; faces in the order -x, +x, -y, +y, -z, +z."""
    return Solid((low, high), box_planes(low, high))


def box_planes(low: Point, high: Point) -> tuple[tuple[Point, float], ...]:
    """Planes of an axis-aligned box in the order -x, +x, -y, +y, -z, +z."""
    return (
        ((-1.0, 0.0, 0.0), -low[0]),
        ((1.0, 0.0, 0.0), high[0]),
        ((0.0, -1.0, 0.0), -low[1]),
        ((0.0, 1.0, 0.0), high[1]),
        ((0.0, 0.0, -1.0), -low[2]),
        ((0.0, 0.0, 1.0), high[2]),
    )


def rod(start: Point, end: Point, radius: float) -> Solid:
    """Cylinder from one point to another; face 0 is the foot, 1 the head, 2 the mantle."""
    a, b = np.array(start), np.array(end)
    axis = (b - a) / np.linalg.norm(b - a)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    side = np.cross(axis, helper)
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    reach = radius * np.sqrt(np.maximum(0, 1 - axis**2))
    return Solid(
        (_point(np.minimum(a, b) - reach), _point(np.maximum(a, b) + reach)),
        ((_point(-axis), float(-axis @ a)), (_point(axis), float(axis @ b))),
        (Quadric(start, (_point(side / radius), _point(other / radius))),),
    )


def ellipsoid(centre: Point, radii: Point) -> Solid:
    """Ellipsoid with axes along the world's."""
    c, r = np.array(centre), np.array(radii)
    rows = tuple(_point(row) for row in np.diag(1 / r))
    return Solid((_point(c - r), _point(c + r)), (), (Quadric(centre, rows),))


def _point(v: Array) -> Point:
    return float(v[0]), float(v[1]), float(v[2])
