"""Dense metric depth from one LiDAR scan and the image it belongs to.

All interpolation is in inverse depth, in which a plane is linear over the image. Inside the scan: linear over a
Delaunay triangulation of the returns; where a triangle spans two surfaces, the image decides. Outside: surfaces go on
upwards at their depth as far as the image shows no edge; the ground goes on as the plane it is.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError, cKDTree

from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.smoothing import guide_weights, smooth, spread
from aw4d.extract.visibility import visible_uvz

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RETURNS_MIN = 10
MARGIN = 20.0  # [px] returns just outside the image still shape what is inside
RING_STRETCH = 1.75  # returns are dense along a ring, sparse between rings: a row counts as this many columns
JUMP_RATIO = 1.15  # a triangle whose corners differ by more spans two surfaces
ON_GROUND, STANDING = 0.15, 0.3  # [m] above the ground plane; a triangle with corners of both kinds spans two surfaces
NEIGHBOURS = 6
SAME_SURFACE = 0.1  # relative difference of inverse depth within a surface
DEPTH_RANGE = (0.1, 500.0)  # [m]
MIX = 0.3
RIM = 10
ARRIVED_MIN = 1e-4


class _Scan:
    """The returns that the camera sees: pixels (N, 2), inverse depth (N,) and their relation to the ground plane."""

    def __init__(self, uvz: Array, camera: Camera) -> None:
        self.shape = camera.shape
        self.pixels, self.z, self.inverse = uvz[:, :2], uvz[:, 2], 1 / uvz[:, 2]
        rays = np.column_stack([(self.pixels - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]], np.ones(len(uvz))])
        low = self.pixels[:, 1] >= np.percentile(self.pixels[:, 1], 60)
        plane = _ground_plane(rays[low], self.inverse[low])
        self.ground = camera.rays() @ plane  # (H, W) inverse depth of the ground plane, negative above its horizon
        self.ground_inverse = rays @ plane
        height = (1 - self.z * self.ground_inverse) / max(float(np.linalg.norm(plane)), 1e-9)  # [m] above the ground
        self.on_ground = np.abs(height) < ON_GROUND
        self.standing = height > STANDING


def _ground_plane(rays: Array, inverse: Array) -> Array:
    """Ground plane (a, b, c) [1/m] with inverse depth a x + b y + c for the ray (x, y, 1); zeros where there is none."""
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
    inverse, known, jump = np.zeros(scan.shape), np.zeros(scan.shape, np.bool_), np.zeros(scan.shape, np.bool_)
    stretch = (1.0, RING_STRETCH)
    try:
        mesh = Delaunay(scan.pixels * stretch)
    except QhullError:  # all returns on one line
        return inverse, known, jump
    v, u = np.indices(scan.shape).reshape(2, -1)
    reach = (v >= scan.pixels[:, 1].min()) & (v <= scan.pixels[:, 1].max())
    v, u = v[reach], u[reach]
    triangle = mesh.find_simplex(np.stack([u, v], axis=-1) * stretch)
    inside = triangle >= 0
    triangle, v, u = triangle[inside], v[inside], u[inside]

    transform, q = mesh.transform[triangle], scan.inverse[mesh.simplices]
    share = np.einsum("nij,nj->ni", transform[:, :2], np.stack([u, v], axis=-1) * stretch - transform[:, 2])
    inverse[v, u] = q[triangle, 2] + ((q[:, :2] - q[:, 2:])[triangle] * share).sum(axis=1)
    foot = scan.on_ground[mesh.simplices].any(axis=1) & scan.standing[mesh.simplices].any(axis=1)
    known[v, u], jump[v, u] = True, ((q.max(axis=1) > JUMP_RATIO * q.min(axis=1)) | foot)[triangle]
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
    inverse[decide] = MIX * estimate[decide] + (1 - MIX) * _snap(estimate, decide, scan)
    return inverse, known & (decide | ~jump)


def _rim(known: Mask, rows: slice) -> Mask:
    """Known pixels within RIM of the end of their column's known part, looking along `rows`."""
    return known & (np.cumsum(known[rows], axis=0)[rows] <= RIM)


def _extend(inverse: Array, known: Mask, ground: Array, *, rgb: NDArray[np.uint8], sky: Mask) -> Array:
    """Continue surfaces where the scan has none: upwards at their depth, downwards with the slope of the ground."""
    across, down = _affinity(_guide(rgb, 1.5), sky, 8.0)
    top, bottom = _rim(known, np.s_[::1]), _rim(known, np.s_[::-1])
    above, _ = spread(inverse, top.astype(float), across=300 * across, down=10000 * down)
    below, _ = spread(inverse - ground, bottom.astype(float), across=300 * across, down=300 * down)
    between, _ = spread(inverse, known.astype(float), across=100 * across, down=30 * down)
    rows = np.arange(known.shape[0])[:, None]
    lowest = np.where(known, rows, -1).max(axis=0)
    highest = np.where(known, rows, known.shape[0]).min(axis=0)
    outside = np.where(rows > lowest, below + ground, np.where(rows < highest, above, between))
    return np.where(known, inverse, outside)


def complete_depth(
    points: NDArray[np.float32], *, rgb: NDArray[np.uint8], camera: Camera, sky: NDArray[np.bool_]
) -> NDArray[np.float32]:
    scan = _Scan(visible_uvz(points, camera=camera, margin=MARGIN), camera)
    inverse, known, jump = _interpolate(scan)
    inverse, known = _resolve_jumps(inverse, known & ~sky, jump & ~sky, scan, rgb=rgb, sky=sky)
    inverse = _extend(inverse, known, np.maximum(scan.ground, 0), rgb=rgb, sky=sky)
    near, far = DEPTH_RANGE
    return (1 / np.clip(inverse, 1 / far, 1 / near)).astype(np.float32)
