"""Outlines of vehicles in mask and depth, put where the picture has them.

A mask drawn from a box is that of a generic car, and a laser strikes between pixels, from elsewhere than the camera:
both lie some pixels off the car's outline, and a wall at the car's depth is a bright rim in light that comes from near.
Every pixel near the outline goes to the car or to what is beside it, whichever it is alike in colour some pixels away.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

Single = NDArray[np.float32]
Mask = NDArray[np.bool_]
Ids = NDArray[np.int32]
Index = NDArray[np.intp]

REACH, SHARE = 6.0, 0.1  # how far off the outline may lie [px], and the same as a share of the vehicle's height
FOCAL = 720.0  # [px] for which REACH holds
SPREAD = 10.0  # [CIE Lab] of a surface's colour
BELIEF = 1.5  # log odds for what the mask says, halfway from the outline
LIKELIHOOD_MIN = 0.02  # a colour that neither side has says nothing
TOGETHER = 1.2  # [px] neighbours decide together
ALIKE = 0.07  # share of inverse depth by which a surface varies over the reach
DIRECTIONS = ((1.0, 0.0), (0.7, 0.7), (0.0, 1.0), (-0.7, 0.7), (-1.0, 0.0), (-0.7, -0.7), (0.0, -1.0), (0.7, -0.7))


@dataclass(frozen=True, kw_only=True)
class _Beside:
    """What lies on either side of pixels (n,): log odds of the vehicle by colour, inverse depth of both [1/m]."""

    odds: Single
    vehicle: Single
    other: Single
    both: Mask  # both sides were found


def _beside(
    pixel: tuple[Index, Index], inside: Mask, outside: Mask, *, q: Single, ground: Single, guide: Single, reach: float
) -> _Beside:
    """Mean over pixels some way off, in eight directions; other depths count by how much their colour is alike."""
    height, width = q.shape
    count, like, depth = (np.zeros((2, len(pixel[0])), dtype=np.float32) for _ in range(3))
    colour, level = guide[pixel], ground[pixel]
    for distance in (1.3 * reach, 2.2 * reach):
        for du, dv in DIRECTIONS:
            row = np.clip(pixel[0] + round(dv * distance), 0, height - 1)
            column = np.clip(pixel[1] + round(du * distance), 0, width - 1)
            there, g = q[row, column], ground[row, column]
            there = np.where(np.abs(there - g) < ALIKE * there, there - g + level, there)  # the ground keeps its slope
            alike = np.exp(((guide[row, column] - colour) ** 2).sum(axis=-1) / np.float32(-2 * SPREAD**2))
            for side, mask in enumerate((inside, outside)):
                share = mask[row, column].astype(np.float32)
                count[side] += share
                like[side] += share * alike
                depth[side] += share * (alike + 1e-3) * there
    mean = depth / np.maximum(like + 1e-3 * count, 1e-9)
    chance = like / np.maximum(count, 1) + LIKELIHOOD_MIN
    return _Beside(
        odds=np.log(chance[0] / chance[1]), vehicle=mean[0], other=mean[1], both=np.asarray((count > 0).all(axis=0))
    )


def _settle(q: Single, vehicle: Ids, instance: int, *, ground: Single, guide: Single, sky: Mask, reach: float) -> None:
    """Move the outline of one vehicle, in place."""
    mask = vehicle == instance
    distance = np.where(mask, distance_transform_edt(mask), -distance_transform_edt(~mask)).astype(np.float32)
    band = (np.abs(distance) <= reach) & ~sky & (mask | (vehicle == 0))
    rows, columns = np.nonzero(band)
    pixel = rows, columns
    inside, outside = distance > reach, (distance < -reach) & ~sky
    beside = _beside(pixel, inside, outside, q=q, ground=ground, guide=guide, reach=reach)
    odds = np.where(mask, BELIEF, -BELIEF).astype(np.float32)
    believed = 2 * BELIEF * distance[pixel] / reach
    odds[pixel] = np.where(beside.both, beside.odds + believed, odds[pixel])
    is_vehicle = np.asarray(cv2.GaussianBlur(odds, (0, 0), TOGETHER))[pixel] > 0
    own = q[pixel]
    fits = np.abs(own / np.maximum(np.where(is_vehicle, beside.vehicle, beside.other), 1e-6) - 1)
    strays = np.abs(own / np.maximum(np.where(is_vehicle, beside.other, beside.vehicle), 1e-6) - 1)
    change = beside.both & (fits > ALIKE) & ((is_vehicle != mask[pixel]) | (strays < fits) | ~is_vehicle)
    q[pixel] = np.where(change, np.where(is_vehicle, beside.vehicle, beside.other), own)
    vehicle[pixel] = np.where(beside.both, np.where(is_vehicle, instance, 0), vehicle[pixel])


def settle_outlines(
    depth: Single, vehicle: Ids, *, rgb: NDArray[np.uint8], ground: NDArray[np.float64], sky: Mask, focal: float
) -> tuple[Single, Ids]:
    """Depth and vehicles with the vehicles' outlines where the picture has them.

    Parameters
    ----------
    depth
        (H, W) z [m].
    vehicle
        (H, W) instance ids, 0 = none.
    rgb
        (H, W, 3) sRGB.
    ground
        (H, W) inverse depth of the ground plane [1/m]; 0 where there is none.
    sky
        (H, W), pixels that see nothing but sky: they stay.
    focal
        Focal length [px].

    Returns
    -------
    tuple
        (H, W) z [m] and (H, W) ids. A pixel that changes sides takes the depth of what it is alike there.
    """
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    guide = np.asarray(cv2.GaussianBlur(lab, (0, 0), 0.6), dtype=np.float32)
    level = ground.astype(np.float32)
    q, ids = (1 / depth).astype(np.float32), vehicle.copy()
    for instance in np.unique(vehicle[vehicle > 0]):
        rows, columns = np.nonzero(vehicle == instance)
        reach = float(np.clip(SHARE * np.ptp(rows), 1.0, REACH * focal / FOCAL))
        margin = round(3 * reach) + 1
        window = np.s_[
            max(rows.min() - margin, 0) : rows.max() + margin + 1,
            max(columns.min() - margin, 0) : columns.max() + margin + 1,
        ]
        _settle(
            q[window],
            ids[window],
            int(instance),
            ground=level[window],
            guide=guide[window],
            sky=sky[window],
            reach=reach,
        )
    moved = np.abs(q * depth - 1) > 1e-5
    return np.where(moved, 1 / q, depth).astype(np.float32), ids
