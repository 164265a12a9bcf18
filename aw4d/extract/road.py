"""Road mask of one frame from the ground plane, colour and laser reflectance; no learned weights.

Three kinds of evidence are added as log odds: the height above the plane of the lane ahead (a kerb is a step of a
decimetre), the colour compared with the surface just ahead of the car and with the verges beside it, and the
reflectance of laser returns compared with theirs. What joins the lane ahead, or lies level with it and looks like it,
is road.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.calibrate.ground import GroundPlane, fit_ground
from aw4d.camera import Camera
from aw4d.errors import InputError
from aw4d.extract.pixels import check_sizes, pixels_of

Mask = NDArray[np.bool_]
Image = NDArray[np.float32]

LANE = 4.0  # [m] half width of the corridor ahead in which the ground is sought
NEAR = 40.0  # [m] and its length
SAMPLE = 1e-3  # share of the picture under which a region says nothing about colour
UP = (0.0, -1.0, 0.0)  # a driving camera is level within the 30 degrees that fit_ground grants


def lane_ground(points: NDArray[np.float32] | None, *, seed: int = 0) -> GroundPlane | None:
    """Plane of the lane ahead, from points in the camera frame [m], (N, 3).

    None where there are no points or no level ground ahead (`fit_ground`).
    """
    if points is None:
        return None
    ahead = (np.abs(points[:, 0]) < LANE) & (points[:, 1] > 0) & (points[:, 2] > 0) & (points[:, 2] < NEAR)
    try:
        return fit_ground(points[ahead], up=UP, seed=seed)
    except InputError:
        return None


def _height_odds(height: Image, z: Image) -> Image:
    """Log odds of road by height: +1.5 on the plane, falling through 0 at half a kerb, weaker with distance."""
    tolerance = 0.07 + 0.004 * z
    odds = np.clip(1.5 * (1 - (height / tolerance) ** 2), -4, 1.5)
    return np.asarray(odds / (1 + (z / 40) ** 2), dtype=np.float32)


def _colour_index(rgb: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Cell of a histogram over log brightness and two log chromaticities, which scale with the light, (H, W)."""
    smooth = cv2.GaussianBlur(rgb, (5, 5), 0).astype(np.float32) / 255
    red, green, blue = cv2.split(np.log(smooth**2.2 + 2e-3))
    value = np.clip((red + green + blue) * (7 / 18) + 7.99, 0, 7).astype(np.int64)
    warm = np.clip((red - blue) * 6 + 8, 0, 15).astype(np.int64)
    lush = np.clip((green - (red + blue) / 2) * 12 + 8, 0, 15).astype(np.int64)
    return np.asarray((value * 16 + warm) * 16 + lush, dtype=np.int64)


def _colour_odds(index: NDArray[np.int64], lane: Mask, verge: Mask) -> Image:
    """Log odds of road by colour, from the histograms of the lane ahead and of what stands or grows beside it."""
    histograms = []
    # The higher floor of the verge makes a colour that neither shows count against the road.
    for region, floor in ((lane, 2e-5), (verge, 2e-4)):
        counts = np.bincount(index[region], minlength=8 * 16 * 16).astype(np.float32).reshape(8, 16, 16)
        for axis in range(3):
            kernel = np.array([1, 2, 1], np.float32) / 4
            counts = np.apply_along_axis(np.convolve, axis, counts, kernel, mode="same")
        histograms.append((counts / max(counts.sum(), 1) + floor).ravel())
    odds = np.clip(np.log(histograms[0] / histograms[1]), -2.5, 2.5)
    return np.asarray(odds[index], dtype=np.float32)


def _level_odds(normal: NDArray[np.float32], ground: GroundPlane, z: Image) -> Image:
    """Log odds of road by inclination: nothing on level ground, down to -3 on a wall, fading with distance."""
    inclination = 1 - np.einsum("hwc,c->hw", normal, ground.normal.astype(np.float32))
    return np.asarray(-3 * np.clip((inclination - 0.15) / 0.5, 0, 1) / (1 + (z / 20) ** 2), dtype=np.float32)


def _reflectance_odds(
    reflectance: NDArray[np.float32], points: NDArray[np.float32], camera: Camera, lane: Mask, verge: Mask
) -> Image:
    """Log odds of road by laser reflectance (asphalt is dark at 905 nm, grass bright), spread over 15x15 px."""
    row, column, index = pixels_of(points, camera)
    # The return weakens with distance, so the comparison is made within steps of 5 m.
    step, value = np.minimum(points[index, 2] / 5, 7), np.clip(reflectance[index] * 16, 0, 15)
    cell = step.astype(np.int64) * 16 + value.astype(np.int64)
    histograms = []
    for region in (lane, verge):
        counts = np.bincount(cell[region[row, column]], minlength=8 * 16).astype(np.float64).reshape(8, 16)
        histograms.append(((counts + 0.5) / (counts + 0.5).sum(axis=1, keepdims=True)).ravel())
    odds = np.clip(np.log(histograms[0] / histograms[1]), -1.5, 1.5)
    total, count = np.zeros(camera.shape, np.float32), np.zeros(camera.shape, np.float32)
    total[row, column], count[row, column] = odds[cell], 1
    size = (15, 15)
    return np.asarray(cv2.blur(total, size) / np.maximum(cv2.blur(count, size), 1 / 225), dtype=np.float32)


def _clean(road: Mask, lane: Mask, height: Image) -> Mask:
    """Close markings and cracks; keep what joins the lane ahead, and large surfaces level with it."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
    mask = cv2.morphologyEx(road.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    ahead = np.bincount(labels[lane], minlength=len(stats)) > 0.1 * np.count_nonzero(lane)
    wide = stats[:, cv2.CC_STAT_WIDTH] > 2 * stats[:, cv2.CC_STAT_HEIGHT]
    keep = ahead | (wide & (stats[:, cv2.CC_STAT_AREA] > 2e-3 * road.size))
    keep[0] = False
    mask = keep[labels].astype(np.uint8)
    _, holes, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < 1e-3 * road.size
    small[0] = False
    return np.asarray((mask > 0) | (small[holes] & (np.abs(height) < 0.1)), dtype=np.bool_)


def road_mask(
    rgb: NDArray[np.uint8],
    *,
    camera: Camera,
    depth: NDArray[np.float32],
    normal: NDArray[np.float32],
    points: NDArray[np.float32] | None,
    sky: Mask,
    reflectance: NDArray[np.float32] | None = None,
) -> Mask:
    """Drivable ground.

    Parameters
    ----------
    rgb
        Recorded image, (H, W, 3) sRGB, uint8.
    camera
        The frame's camera, level within 30 degrees.
    depth
        Dense metric depth, (H, W) [m].
    normal
        Unit normals, (H, W, 3), camera frame, facing the camera.
    points
        Laser returns in the camera frame [m], (N, 3), or None: then the depth plane itself gives the ground.
    sky
        (H, W) mask.
    reflectance
        Of the returns, (N,), 0 to 1, or None.

    Returns
    -------
    (H, W) bool; all False where no level ground lies ahead. Vehicles are to be taken out by the caller.

    Raises
    ------
    InputError
        A plane is not of the camera's size.
    """
    check_sizes(camera, rgb=rgb, depth=depth, normal=normal, sky=sky)
    surface = camera.unproject(depth)
    ground = lane_ground(points if points is not None else surface[~sky].astype(np.float32))
    if ground is None:
        return np.zeros(camera.shape, dtype=np.bool_)
    height = ground.height(surface).astype(np.float32)
    low = (height < 1.0) & (surface @ ground.normal < 0) & ~sky
    lane = (np.abs(surface[..., 0]) < 1.5) & (depth < NEAR) & (np.abs(height) < 0.08) & low
    verge = (height > 0.15) & (height < 1.85) & (depth < NEAR) & ~sky
    if np.count_nonzero(verge) >= SAMPLE * verge.size:
        odds = _height_odds(height, depth) + _level_odds(normal, ground, depth)
    else:
        # Depth that shows nothing but a plane (one camera, no laser) tells no road from what stands on it.
        verge = ~sky & (~low | (np.abs(surface[..., 0]) > 3 * LANE))
        lane &= depth > 5  # nearer is the bonnet
        odds = np.full(camera.shape, -0.5, dtype=np.float32)
    if np.count_nonzero(lane) >= SAMPLE * lane.size:
        odds += _colour_odds(_colour_index(rgb), lane, verge)
        if points is not None and reflectance is not None:
            odds += _reflectance_odds(reflectance, points, camera, lane, verge)
    return _clean((cv2.blur(odds, (5, 5)) > 0) & low, lane, height)
