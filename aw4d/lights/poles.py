"""Street lamps where no mask shows any: upright thin poles that stand alone beside the road, in the laser returns.

A scanner on the roof sees hardly above the horizon, of a pole 30 m away not even the lower 3 m. So a pole counts as
tall if returns show it so, or if it goes on to the scan's upper end in the frames that could have shown its top. Signs
end below it; trunks are thicker, and their crowns and bushes stand around them.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aw4d import cache
from aw4d.clip import Clip
from aw4d.lights import clusters
from aw4d.lights.clusters import components
from aw4d.lights.light import Light
from aw4d.lights.street_lamps import spots
from aw4d.params import StreetLampParams

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FRAMES = 200  # frames that are searched at most
FARTHEST = 80.0  # [m] beyond it a pole is a few returns
GROUND_CELL = 2.0  # [m] cells whose lowest returns are the ground
LOW = 1.5  # [m] above ground; boxes and bushes at a pole's foot are lower
LINK = 0.5  # [m] two rows of a scanner's returns on a pole 50 m away are 0.4 m apart
FEWEST = 20  # returns on a pole
FEWEST_FRAMES = 4  # in which it is seen
THICK, WANDER = 0.35, 0.8  # [m] width in one frame, extent over all of them: poses drift
AROUND = (0.5, 1.5)  # [m] radii of the ring around a pole where nothing may stand
CROWD = 0.1  # share of the pole's own returns that may
TALL = 4.0  # [m] seen height from which on a pole carries a lamp
DISTANT = 15.0  # [m] from which on scanner and camera see along one line
TELLING = 3.4  # [m] height at the scan's end from which on a frame tells a pole from a sign post
TOLERANCE = 0.35  # [deg] from the scan's upper end: less than a row
BESIDE = (2.0, 15.0)  # [m] distances from the way driven


@dataclass(frozen=True, eq=False)
class _Returns:
    """Laser returns of many frames, one row each."""

    points: Array  # (N, 3) world [m]
    frame: Index
    height: Array  # above ground [m]
    end: Array  # height above ground of the scan's upper end, where the return is [m]
    aside: Array  # place across the view [m], for widths

    def chosen(self, which: NDArray[np.generic]) -> _Returns:
        return _Returns(*(values[which] for values in vars(self).values()))


def _heights(points: Array) -> Array:
    """Height above the lowest returns around, the twentieth part of each cell's left out as strays [m]."""
    cell = np.floor(points[:, [0, 2]] / GROUND_CELL).astype(np.int64)
    _, inverse = np.unique(cell, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    if not len(points):
        return np.zeros(0)
    order = np.lexsort((points[:, 1], inverse))
    count = np.bincount(inverse)
    start = np.cumsum(count) - count
    return np.asarray(points[:, 1] - points[order, 1][start + count // 20][inverse], dtype=np.float64)


def _scan(clip: Clip, index: int) -> tuple[Array, Index, Array, Array, Array]:
    """Returns of a frame, world [m] (n, 3), its number, and of each the level distance, slope and place aside."""
    scan = clip.points(index)
    p = np.zeros((0, 3)) if scan is None else scan[:, :3].astype(np.float64)
    p = p[np.linalg.norm(p, axis=1) < FARTHEST]
    level = np.hypot(p[:, 0], p[:, 2])
    slope = -p[:, 1] / np.maximum(level, 1e-6)
    aside = p[:, 0] / np.maximum(p[:, 2], 1.0) * level
    return clip.info.camera(index).to_world(p), np.full(len(p), index), level, slope, aside


def _scan_end(level: Array, slope: Array) -> Array:
    """Height over the camera to which the scanner sees at a level distance [m].

    It turns with the camera, so that its upper end is one slope of all frames; not of what is near, for it stands
    beside the camera.
    """
    upwards = slope[(slope > 0) & (level > DISTANT)]
    end = float(np.quantile(upwards, 0.98)) if len(upwards) else 0.0
    return np.asarray((end - np.tan(np.deg2rad(TOLERANCE))) * level, dtype=np.float64)


def _returns(clip: Clip, every: int) -> _Returns:
    """Returns of every so many frames."""
    step = max(every, -(-len(clip) // FRAMES))
    parts = [_scan(clip, index) for index in range(0, len(clip), step)]
    points, frame, level, slope, aside = (np.concatenate(values) for values in zip(*parts, strict=True))
    height = _heights(points)
    # Both over the camera, so that its pitch, which the slopes have, does not count.
    end = height + _scan_end(level, slope) - slope * level
    return _Returns(points, frame, height, end, aside)


def _is_thin(pole: _Returns) -> bool:
    """Whether no frame, by the median, shows it wide, and all together do not either."""
    low, high = np.quantile(pole.points[:, [0, 2]], (0.05, 0.95), axis=0)
    frames, place, count = np.unique(pole.frame, return_inverse=True, return_counts=True)
    if len(frames) < FEWEST_FRAMES or (high - low).max() > WANDER:
        return False
    left, right = np.full(len(frames), np.inf), np.full(len(frames), -np.inf)
    np.minimum.at(left, place, pole.aside)
    np.maximum.at(right, place, pole.aside)
    several = count >= 3
    return bool(several.any() and np.median((right - left)[several]) <= THICK)


def _is_tall(pole: _Returns) -> bool:
    """Whether it is seen to be tall, or goes on to the scan's end in most frames that could show its top."""
    if np.quantile(pole.height, 0.98) >= TALL:
        return True
    frames, place = np.unique(pole.frame, return_inverse=True)
    top, end = np.full(len(frames), -np.inf), np.full(len(frames), -np.inf)
    np.maximum.at(top, place, pole.height)
    np.maximum.at(end, place, pole.end)
    telling = end >= TELLING - 1e-9
    reaches = top[telling] >= end[telling]
    return bool(len(reaches) >= FEWEST_FRAMES and np.count_nonzero(reaches) >= 0.6 * len(reaches))


def _stands_alone(pole: _Returns, around: _Returns) -> bool:
    foot = np.median(pole.points[:, [0, 2]], axis=0)
    radius = np.linalg.norm(around.points[:, [0, 2]] - foot, axis=1)
    ring = (radius > AROUND[0]) & (radius < AROUND[1]) & (around.height < pole.height.max() + 3)
    return bool(np.count_nonzero(ring) <= CROWD * len(pole.points))


def _poles(returns: _Returns) -> Array:
    """Feet of the poles, (n, 3) world [m]."""
    raised = returns.chosen(returns.height > LOW)
    if not len(raised.points):
        return np.zeros((0, 3))
    label = components(raised.points, LINK)
    order = np.argsort(label, kind="stable")
    feet = []
    for members in np.split(order, np.cumsum(np.bincount(label))[:-1]):
        if len(members) < FEWEST:
            continue
        pole = raised.chosen(members)
        starts_low = pole.height.min() < LOW + 0.5
        if starts_low and _is_thin(pole) and _is_tall(pole) and _stands_alone(pole, raised):
            x, z = np.median(pole.points[:, [0, 2]], axis=0)
            feet.append((x, np.median(pole.points[:, 1] - pole.height), z))
    return np.array(feet).reshape(-1, 3)


def _way(camera_to_world: Array) -> Array:
    """The way driven in plan and as far straight ahead as the laser sees, a point every 0.25 m, (n, 2)."""
    driven = camera_to_world[:, [0, 2], 3]
    ahead = camera_to_world[-1, [0, 2], 2]
    end = driven[-1] + FARTHEST * ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    corners = np.concatenate([driven, end[None]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.arange(0.0, length[-1], 0.25)
    return np.stack([np.interp(at, length, corners[:, axis]) for axis in range(2)], axis=-1)


def _lamps(feet: Array, way: Array, params: StreetLampParams) -> Array:
    """Lamps at the poles beside the way, hung towards it, (L, 3) world [m], in the order in which one passes them."""
    offset = way[None] - feet[:, None, ::2]
    distance = np.linalg.norm(offset, axis=-1)
    nearest = distance.argmin(axis=1)
    lamps: list[Array] = []
    for number in np.lexsort((distance.min(axis=1), nearest)):
        aside = distance[number, nearest[number]]
        foot = feet[number]
        apart = all(np.linalg.norm((foot - lamp)[::2]) >= params.pole_spacing_m for lamp in lamps)
        if BESIDE[0] <= aside <= BESIDE[1] and apart:
            x, z = foot[::2] + offset[number, nearest[number]] / aside * params.pole_overhang_m
            lamps.append(np.array([x, foot[1] + params.pole_mount_m, z]))
    return np.array(lamps).reshape(-1, 3)


def pole_lamps(clip: Clip, params: StreetLampParams, *, white_cd_m2: float) -> list[Light]:
    """Spots at poles beside the road, "pole-1", "pole-2", ...; none where the laser shows no pole.

    Parameters
    ----------
    clip
        A clip with laser returns and poses; without returns it has no poles.
    params
        Strength and cone, height and overhang of the lamps, and the step in which frames are searched.
    white_cd_m2
        The luminance that the picture shows as white.
    """
    key = (cache.source_of(sys.modules[__name__], clusters), clip.stamp(["points"]), params.every)
    feet = cache.kept("poles", key, lambda: {"feet": _poles(_returns(clip, params.every))})["feet"]
    lamps = _lamps(feet, _way(clip.info.camera_to_world), params)
    return spots(lamps, params, white_cd_m2=white_cd_m2, name="pole")
