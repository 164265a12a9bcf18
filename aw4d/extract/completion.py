"""Dense metric depth from one LiDAR scan and the image it belongs to.

All interpolation is in inverse depth, in which a plane is linear over the image. Inside the scan: linear over a
Delaunay triangulation of the returns; where a triangle spans two surfaces, the image decides. Outside: surfaces go on
upwards at their depth as far as the image shows no edge; the ground goes on as the plane it is.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, uniform_filter1d
from scipy.spatial import Delaunay, QhullError, cKDTree

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.smoothing import guide_weights, spread
from aw4d.extract.visibility import above_scan, visible_uvz

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RETURNS_MIN = 10
MARGIN = 20.0  # [px] returns just outside the image still shape what is inside
DEPTH_RANGE = (0.1, 500.0)  # [m]

# Returns are dense along a ring and sparse between rings: a row counts as this many columns.
RING_STRETCH = 1.75
RING_APART = 10.0  # the same, to keep to one ring
RING_RETURNS, RING_REACH = 7, 6.0  # neighbours on a ring, and how far they may be [px]
RING_NOISE = 0.01  # relative range noise, generously

JUMP_RATIO = 1.15  # a triangle whose corners differ by more spans two surfaces
ON_GROUND, STANDING = 0.2, 0.4  # [m] above the ground plane; a triangle with corners of both kinds does so too
NEIGHBOURS = 16  # returns that a pixel between two surfaces chooses from
SAME_SURFACE = 0.1  # relative difference of inverse depth within a surface
SHARPNESS = 0.5  # share of the choice, against the smooth estimate, which errs less where the image shows no edge
ARRIVED_MIN = 1e-4  # share of a return that must reach a pixel to decide there
DRIFT = (0.25, 0.5, 0.25)  # shares of the pixels under one, from the left to the right, in what is carried up to it
SURFACE_EDGE = 8.0  # [CIE Lab] a step in the image that tells surfaces apart where there is no scan
RIM = 5  # rows at the end of the scan that are carried on
LEVEL = 0.3  # share of the eye's height by which ground may lie off the plane where the scan ends
LEVEL_WIDTH = 15  # [px] over which the end of the scan on the ground is evened
OUT_OF_REACH_M = 100.0  # what a beam finds no end to is farther


class _Scan:
    """The returns that the camera sees: pixels (N, 2), inverse depth (N,) and their relation to the ground plane."""

    def __init__(self, uvz: Array, camera: Camera) -> None:
        self.shape = camera.shape
        self.pixels = uvz[:, :2]
        self.inverse = _along_rings(self.pixels, 1 / uvz[:, 2])
        rays = np.column_stack([(self.pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], np.ones(len(uvz))])
        low = self.pixels[:, 1] >= np.percentile(self.pixels[:, 1], 60)
        plane = _ground_plane(rays[low], self.inverse[low])
        self.ground = camera.rays() @ plane  # (H, W) inverse depth of the ground plane, negative above its horizon
        self.ground_inverse = rays @ plane
        eye_height = 1 / max(float(np.linalg.norm(plane)), 1e-9)  # [m]
        height = eye_height * (1 - self.ground_inverse / self.inverse)
        self.on_ground = np.abs(height) < ON_GROUND
        self.standing = height > STANDING


def _along_rings(pixels: Array, inverse: Array) -> Array:
    """Inverse depth (N,), each replaced by the value on the line fitted through it and its neighbours on its ring.

    Takes out the range noise of the single return; the rings keep their offsets from one another.
    """
    stretched = pixels * (1.0, RING_APART)
    distance, index = cKDTree(stretched).query(stretched, k=min(RING_RETURNS, len(pixels)))
    offset, q = pixels[index, 0] - pixels[:, :1], inverse[index]
    weight = np.maximum(1 - (distance / RING_REACH) ** 2, 0) * (np.abs(q / inverse[:, None] - 1) < RING_NOISE)
    w0, w1, w2 = ((weight * offset**n).sum(axis=1) for n in range(3))
    q0, q1 = ((weight * offset**n * q).sum(axis=1) for n in range(2))
    determinant = w0 * w2 - w1**2
    enough = determinant > 0.5 * w0**2  # neighbours lie about 1 px apart or more
    return np.where(enough, (w2 * q0 - w1 * q1) / np.where(enough, determinant, 1), inverse)


def _ground_plane(rays: Array, inverse: Array) -> Array:
    """Ground plane (a, b, c) [1/m] with inverse depth a x + b y + c for the ray (x, y, 1); zeros where none is."""
    weight = np.ones(len(rays))
    for _ in range(10):  # Tukey's biweight: what stands on the ground drops out
        plane = np.linalg.lstsq(rays * weight[:, None], inverse * weight, rcond=None)[0]
        residual = np.abs(rays @ plane - inverse)
        scale = 4.685 * max(1.4826 * float(np.median(residual)), 1e-6)
        weight = np.maximum(1 - (residual / scale) ** 2, 0)
    faces_up = plane[1] > 0.8 * np.linalg.norm(plane)
    return np.asarray(plane if faces_up else np.zeros(3))


def _interpolate(scan: _Scan) -> tuple[Array, Mask, Mask]:
    """Linear interpolation of inverse depth; (H, W) inverse depth [1/m], where it is known, where it spans a jump."""
    jump = np.zeros(scan.shape, dtype=np.bool_)
    stretch = (1.0, RING_STRETCH)
    try:
        mesh = Delaunay(scan.pixels * stretch)
    except QhullError:  # all returns on one line
        inverse, count = _splat(scan)
        return inverse, count > 0, jump
    inverse, known = np.zeros(scan.shape), np.zeros(scan.shape, dtype=np.bool_)
    v, u = np.indices(scan.shape).reshape(2, -1)
    reach = (v >= scan.pixels[:, 1].min()) & (v <= scan.pixels[:, 1].max())
    v, u = v[reach], u[reach]
    triangle = mesh.find_simplex(np.stack([u, v], axis=-1) * stretch)
    inside = triangle >= 0
    triangle, v, u = triangle[inside], v[inside], u[inside]

    transform, q = mesh.transform[triangle], scan.inverse[mesh.simplices]
    share = np.einsum("nij,nj->ni", transform[:, :2], np.stack([u, v], axis=-1) * stretch - transform[:, 2])
    inverse[v, u] = q[triangle, 2] + ((q[:, :2] - q[:, 2:])[triangle] * share).sum(axis=1)
    ground, standing = scan.on_ground[mesh.simplices], scan.standing[mesh.simplices]
    foot = ground.any(axis=1) & standing.any(axis=1)
    gap = (q.max(axis=1) > JUMP_RATIO * q.min(axis=1)) & ~ground.all(axis=1)  # far rings on a road lie far apart
    known[v, u], jump[v, u] = True, (gap | foot)[triangle]
    return inverse, known, jump


def _splat(scan: _Scan) -> tuple[Array, Array]:
    """Mean inverse depth of the returns in each pixel and their number, (H, W) each."""
    pixel = np.rint(scan.pixels[:, ::-1]).astype(int)
    inside = ((pixel >= 0) & (pixel < scan.shape)).all(axis=1)
    index = np.ravel_multi_index(tuple(pixel[inside].T), scan.shape)
    size = scan.shape[0] * scan.shape[1]
    count = np.bincount(index, minlength=size).astype(np.float64)
    total = np.bincount(index, weights=scan.inverse[inside], minlength=size)
    return (total / np.maximum(count, 1)).reshape(scan.shape), count.reshape(scan.shape)


def _snap(estimate: Array, where: Mask, scan: _Scan) -> Array:
    """Replace estimates between two surfaces by the surface, out of those of the nearby returns, that is closest.

    A return on the ground speaks for the ground plane through it, another one for an upright surface.
    """
    v, u = np.nonzero(where)
    stretch = (1.0, RING_STRETCH)
    k = min(NEIGHBOURS, len(scan.pixels))
    distance, index = cKDTree(scan.pixels * stretch).query(np.stack([u, v], axis=-1) * stretch, k=k)
    slope = scan.ground[where][:, None] - scan.ground_inverse[index]
    q = np.maximum(scan.inverse[index] + np.where(scan.on_ground[index], slope, 0), 1e-6)
    ratio = np.log(np.maximum(estimate[where], 1e-6)[:, None] / q)
    weight = (np.exp(-((ratio / SAME_SURFACE) ** 2) / 2) + 1e-3) / (distance**4 + 1)
    return np.asarray((weight * q).sum(axis=1) / weight.sum(axis=1))


def _honour_returns(inverse: Array, scan: _Scan) -> Array:
    """Correct the map so that, read between its pixels, it gives the returns back.

    The rings ride a little above or below one another, so the triangulation has a ridge along each that the pixel
    grid cuts off.
    """
    u, v = scan.pixels.astype(np.float32).T
    read = cv2.remap(inverse.astype(np.float32), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).ravel()
    missing = scan.inverse - read
    missing[np.abs(missing) > RING_NOISE * scan.inverse] = 0
    total, weight = np.zeros(scan.shape), np.zeros(scan.shape)
    column, row = np.floor(scan.pixels).astype(int).T
    for du, dv in ((0, 0), (1, 0), (0, 1), (1, 1)):
        share = (1 - np.abs(scan.pixels[:, 0] - column - du)) * (1 - np.abs(scan.pixels[:, 1] - row - dv))
        inside = (column + du >= 0) & (column + du < scan.shape[1]) & (row + dv >= 0) & (row + dv < scan.shape[0])
        pixel = row[inside] + dv, column[inside] + du
        np.add.at(total, pixel, (share * missing)[inside])
        np.add.at(weight, pixel, share[inside])
    total, weight = (np.asarray(cv2.GaussianBlur(a, (7, 1), 1.0), dtype=np.float64) for a in (total, weight))
    return np.asarray(inverse + total / np.maximum(weight, 0.1))


def _guide(rgb: NDArray[np.uint8], blur: float) -> NDArray[np.float32]:
    """CIE Lab image (H, W, 3), lightly blurred: texture finer than that says nothing about surfaces."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    return np.asarray(cv2.GaussianBlur(lab, (0, 0), blur), dtype=np.float32)


def _affinity(guide: NDArray[np.float32], sky: Mask, sigma: float) -> tuple[Array, Array]:
    """Affinity of horizontal and of vertical neighbours: none between sky and anything else."""
    across = guide_weights(guide, sigma, 1) * (sky[:, 1:] == sky[:, :-1])
    down = guide_weights(guide, sigma, 0) * (sky[1:] == sky[:-1])
    return across, down


def _resolve_jumps(
    inverse: Array, known: Mask, jump: Mask, scan: _Scan, *, rgb: NDArray[np.uint8], sky: Mask
) -> tuple[Array, Mask]:
    """Decide between the surfaces of the triangles that span two: carry the returns up to the edges in the image.

    Where no return is near enough to decide, nothing is known.
    """
    across, down = _affinity(_guide(rgb, 0.6), sky, 20.0)
    estimate, arrived = spread(*_splat(scan), across=10 * across, down=3 * down)
    decide = jump & (arrived > ARRIVED_MIN)
    inverse = inverse.copy()
    inverse[decide] = SHARPNESS * _snap(estimate, decide, scan) + (1 - SHARPNESS) * estimate[decide]
    return inverse, known & (decide | ~jump)


def _carry_up(inverse: Array, below: Mask, guide: NDArray[np.float32], sky: Mask) -> tuple[Array, Mask]:
    """Continue the values on the pixels `below` upwards, row by row: (H, W) values and where one arrived.

    Each pixel takes the mean of those under it to the left and right, the more of one the more its colour is alike.
    Along an edge in the image the values so keep apart, elsewhere they mix the more the higher they get.
    """
    values, reached = np.where(below, inverse, 0.0), below.copy()
    columns = np.arange(below.shape[1]) + np.arange(-1, 2)[:, None]  # (3, W)
    inside = (columns >= 0) & (columns < below.shape[1])
    columns = np.clip(columns, 0, below.shape[1] - 1)
    for row in range(int(np.max(np.argmax(below, axis=0))) - 1, -1, -1):
        difference = ((guide[row] - guide[row + 1][columns]) ** 2).sum(axis=-1)
        weight = np.array(DRIFT)[:, None] * (np.exp(-difference / SURFACE_EDGE**2) + 1e-6)
        weight *= inside & reached[row + 1][columns] & (sky[row] == sky[row + 1][columns])
        total = weight.sum(axis=0)
        fresh = ~below[row] & (total > 0)
        mean = (weight * values[row + 1][columns]).sum(axis=0) / np.where(total > 0, total, 1)
        values[row, fresh], reached[row, fresh] = mean[fresh], True
    return values, reached


def _rim(known: Mask, rows: slice) -> Mask:
    """Known pixels within RIM of the end of their column's known part, looking along `rows`."""
    return known & (np.cumsum(known[rows], axis=0)[rows] <= RIM)


def _far_first(inverse: Array, known: Mask) -> Array:
    """Confidence (H, W) of known depths, the depth itself.

    Where the laser struck nothing is more likely the far surface: of the near one it would have had returns.
    """
    return np.where(known, np.maximum(inverse, 1e-3) ** -1.0, 0.0)


def _above(inverse: Array, known: Mask, highest: NDArray[np.intp], guide: NDArray[np.float32], sky: Mask) -> Array:
    """Continue the upper rim of the scan above its `highest` row (W,); a single return's own depth soon fades out."""
    across, down = _affinity(guide, sky, SURFACE_EDGE)
    rim, _ = spread(inverse, _far_first(inverse, _rim(known, np.s_[::1])), across=100 * across, down=100 * down)
    columns, height = np.arange(known.shape[1]), highest - np.arange(known.shape[0])[:, None]
    carried, arrived = _carry_up(rim, (height <= 0) & (rim > 0), guide, sky)
    top = np.minimum(highest, known.shape[0] - 1), columns
    both = (inverse[top] > 0) & (rim[top] > 0)
    ratio = np.divide(inverse[top], rim[top], out=np.ones(len(columns)), where=both)
    carried *= ratio ** np.exp(-np.maximum(height, 0) / RIM)  # no seam
    above, _ = spread(carried, arrived.astype(np.float64), across=30 * across, down=30 * down)
    return above


def _ground_beyond(
    inverse: Array, known: Mask, highest: NDArray[np.intp], ground: Array
) -> tuple[Array, Mask, NDArray[np.intp]]:
    """Continue the ground where the scan ends on it: the beams over its end struck nothing, so nothing stands near.

    Values (H, W) [1/m], where they are known, and the highest row (W,) of each column that is.
    """
    columns = np.arange(known.shape[1])
    top = np.minimum(highest, known.shape[0] - 1), columns
    ratio = np.divide(inverse[top], ground[top], out=np.zeros(len(columns)), where=ground[top] > 0)
    ends = (np.abs(1 - 1 / np.maximum(ratio, 1e-3)) < LEVEL) & (highest < known.shape[0])
    count = np.maximum(uniform_filter1d(ends.astype(np.float64), LEVEL_WIDTH), 1e-9)
    ends &= count > 0.5  # a lone column is no road
    carried = uniform_filter1d(np.where(ends, ratio, 0.0), LEVEL_WIDTH) / count * ground
    fresh = ends & (np.arange(known.shape[0])[:, None] < highest) & (carried > 1 / OUT_OF_REACH_M)
    return np.where(fresh, carried, inverse), known | fresh, highest - fresh.sum(axis=0)


def _extend(inverse: Array, known: Mask, ground: Array, *, rgb: NDArray[np.uint8], sky: Mask) -> Array:
    """Continue surfaces where the scan has none: upwards at their depth, downwards with the slope of the ground.

    Zero where nothing is connected to the scan.
    """
    guide = _guide(rgb, 1.0)
    across, down = _affinity(guide, sky, SURFACE_EDGE)
    bottom = _rim(known, np.s_[::-1])
    below, arrived = spread(inverse - ground, bottom.astype(np.float64), across=300 * across, down=300 * down)
    below += np.where(arrived > 0, ground, 0)
    between, _ = spread(inverse, _far_first(inverse, known), across=100 * across, down=30 * down)
    rows, columns = np.arange(known.shape[0])[:, None], np.arange(known.shape[1])
    reached = np.flatnonzero(known.any(axis=0))
    nearest = reached[np.abs(reached[:, None] - columns).argmin(axis=0)] if reached.size else columns
    lowest = np.where(known, rows, -1).max(axis=0)[nearest]
    highest = np.where(known, rows, known.shape[0]).min(axis=0)[nearest]
    inside = np.where(known, inverse, np.where(rows > lowest, below, between))
    inside, known, highest = _ground_beyond(inside, known, highest, ground)
    above = _above(inside, known, highest, guide, sky)
    return np.where(rows < highest, above, inside)


def _fill_islands(inverse: Array, sky: Mask) -> Array:
    """Give what is not sky and still without depth, such as twigs against the sky, the depth nearest to it."""
    empty = (inverse <= 0) & ~sky
    source = (inverse > 0) & ~sky
    if not empty.any() or not source.any():
        return inverse
    nearest = distance_transform_edt(~source, return_distances=False, return_indices=True)
    return np.where(empty, inverse[tuple(nearest)], inverse)


def _check(rgb: NDArray[np.uint8], sky: Mask, camera: Camera) -> None:
    if rgb.shape != (*camera.shape, 3) or rgb.dtype != np.uint8:
        raise InputError(f"rgb: expected {(*camera.shape, 3)} uint8 sRGB, got {rgb.shape} {rgb.dtype.name}")
    if sky.shape != camera.shape or sky.dtype != np.bool_:
        raise InputError(f"sky: expected {camera.shape} bool, got {sky.shape} {sky.dtype.name}")


def complete_depth(
    points: NDArray[np.float32], *, rgb: NDArray[np.uint8], camera: Camera, sky: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Depth of every pixel from one LiDAR scan and the image.

    Parameters
    ----------
    points
        Returns, (N, 3) in the camera frame [m]; those that are not finite, behind the eye, outside the image or
        hidden from the camera by nearer ones are left out.
    rgb
        (H, W, 3) sRGB.
    camera
        The frame's camera.
    sky
        (H, W), pixels that see nothing but sky.

    Returns
    -------
    NDArray[np.float32]
        (H, W) z [m], finite, within 0.1 to 500 m. What stands on sky pixels has no meaning.

    Raises
    ------
    InputError
        A shape or dtype is wrong, or the camera sees fewer than 10 returns.
    """
    _check(rgb, sky, camera)
    seen = visible_uvz(points, camera=camera, margin=MARGIN)
    if len(seen) < RETURNS_MIN:
        raise InputError(f"points: expected at least {RETURNS_MIN} returns that the camera sees, got {len(seen)}")
    scan = _Scan(seen, camera)
    inverse, known, jump = _interpolate(scan)
    # The mesh closes the scan's upper rim with long triangles from one near trunk to the next, over what is between.
    known &= ~above_scan(seen[:, :2], camera, margin=RIM)
    inverse, known = _resolve_jumps(inverse, known & ~sky, jump & ~sky, scan, rgb=rgb, sky=sky)
    inverse = _honour_returns(inverse, scan)
    inverse = _extend(inverse, known, np.maximum(scan.ground, 0), rgb=rgb, sky=sky)
    inverse = _fill_islands(inverse, sky)
    nearest, farthest = DEPTH_RANGE
    return (1 / np.clip(inverse, 1 / farthest, 1 / nearest)).astype(np.float32)
