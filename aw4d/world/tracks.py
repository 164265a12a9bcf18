"""Where vehicles have driven: ways of the camera's vehicle and of those with boxes, in straight pieces."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.lights.vehicles import ClipKey, moving_vehicles
from aw4d.params import VehicleLightParams
from reference_numpy.world import BLOCK

Array = NDArray[np.float64]

STEP = 0.5  # [m] between the places that make a way: one that waits jitters
SMOOTH = 9  # places that a box's way is averaged over: boxes are drawn by hand
TOLERANCE = 0.02  # [m] between a way and its straight pieces
BEYOND = 500.0  # [m] that a way goes on, straight, before the clip and after it
END = 6.0  # [m] of a way that tell where it goes on to
MARGIN = 3.0  # [m] from its piece within which a way shows, and more


def track_arguments(
    info: ClipInfo, index: int, *, gauge_m: float, width_m: float, moving: VehicleLightParams | None = None
) -> dict[str, Any]:
    """Arguments by name: the pieces of all ways that can show in a picture.

    A pure function of the whole clip, so that ruts stay where they are from frame to frame. What is left out lies
    outside of the camera's view.

    Parameters
    ----------
    info
        Cameras, times and boxes of a clip.
    index
        Number of the picture.
    gauge_m, width_m
        Distance and width of the ruts [m].
    moving
        From which speed on a vehicle drives.

    Returns
    -------
    dict
        `track_segment` (n, 7) float32: middle x and z from the corner of the camera's block, each with what rounding
        took off it [m], direction x and z, half the length [m]; `track_path` (ways + 1,) int32, where the ways begin in
        it, and the end; `track_count`, their number.
    """
    camera = info.camera(index)
    origin = np.asarray(info.world_origin)[[0, 2]]
    eye = camera.camera_to_world[[0, 2], 3] + origin
    corner = np.floor(eye / BLOCK) * BLOCK
    sides = _view(camera)
    reach = gauge_m / 2 + width_m / 2 + MARGIN
    pieces: list[Array] = []
    starts = [0]
    for way in _ways(ClipKey(info), moving or VehicleLightParams()):
        ends = np.stack([way[:-1], way[1:]]) + origin
        seen = np.ones(len(way) - 1, dtype=np.bool_)
        for inward in sides:
            seen &= ((ends - eye) @ inward > -reach).any(axis=0)
        if seen.any():
            pieces.append(_pieces(ends[:, seen] - corner))
            starts.append(starts[-1] + int(seen.sum()))
    table = np.concatenate(pieces) if pieces else np.zeros((0, 7))
    return {
        "track_segment": table.astype(np.float32),
        "track_path": np.array(starts, dtype=np.int32),
        "track_count": len(starts) - 1,
    }


def _pieces(ends: Array) -> Array:
    """Rows of `track_segment` of pieces between two ends, (2, n, 2)."""
    middle, along = ends.mean(axis=0), ends[1] - ends[0]
    length = np.hypot(*along.T)[:, None]
    rest = middle - middle.astype(np.float32)
    return np.concatenate([middle[:, :1], rest[:, :1], middle[:, 1:], rest[:, 1:], along / length, length / 2], axis=1)


def _view(camera: Camera) -> list[Array]:
    """Directions (x, z) into the view from the two vertical planes that bound it; none where it reaches all around."""
    height, width = camera.shape
    corners = np.array([(u, v, 1.0) for u in (-0.5, width - 0.5) for v in (-0.5, height - 0.5)])
    rays = corners @ np.linalg.inv(camera.K).T @ camera.camera_to_world[:3, :3].T
    flat = rays[:, [0, 2]]
    # The widest pair of rays bounds the view where all others lie between the two.
    for first in flat:
        for last in flat:
            inward = [np.array([-first[1], first[0]]), np.array([last[1], -last[0]])]
            lengths = [float(np.hypot(*side)) for side in inward]
            if first[0] * last[1] - first[1] * last[0] > 1e-9 and min(lengths) > 0:
                inward = [side / length for side, length in zip(inward, lengths, strict=True)]
                if all((flat @ side > -1e-9).all() for side in inward):
                    return inward
    return []


@lru_cache(maxsize=4)  # every frame asks for all of them
def _ways(key: ClipKey, moving: VehicleLightParams) -> tuple[Array, ...]:
    """Corners (n, 2) of the polylines along which vehicles drive, x and z about the clip's origin."""
    info = key.info
    ego = _spaced(info.camera_to_world[:, :3, 3][:, [0, 2]])
    ways = [_ahead(info.camera_to_world[0]) if len(ego) < 2 else ego]
    for centres in moving_vehicles(info, moving).values():
        way = _averaged(_spaced(centres[:, [0, 2]]))
        if len(way) > 1:
            ways.append(way)
    return tuple(_extended(_simplified(way)) for way in ways if len(way) > 1)


def _ahead(camera_to_world: Array) -> Array:
    """A metre of way under a camera that stands, the way it looks; nothing where it looks down."""
    here, forward = camera_to_world[[0, 2], 3], camera_to_world[[0, 2], 2]
    length = float(np.hypot(*forward))
    return np.array([here, here + forward / length]) if length > 0.1 else here[None]


def _spaced(places: Array) -> Array:
    """Places (n, 2) without those that are nearer than STEP to the one before."""
    kept = [places[0]]
    for place in places[1:]:
        if np.hypot(*(place - kept[-1])) >= STEP:
            kept.append(place)
    return np.array(kept)


def _averaged(way: Array) -> Array:
    """A way smoothed along itself, and so much shorter; a short one as it is."""
    if len(way) < 2 * SMOOTH:
        return way
    half = SMOOTH // 2
    sums = np.cumsum(np.concatenate([np.zeros((1, 2)), way]), axis=0)
    return np.asarray((sums[2 * half + 1 :] - sums[: -2 * half - 1]) / SMOOTH, dtype=np.float64)


def _simplified(way: Array) -> Array:
    """The fewest corners of a way that this search finds within TOLERANCE of it. Douglas and Peucker 1973."""
    keep = np.zeros(len(way), dtype=np.bool_)
    keep[[0, -1]] = True
    spans = [(0, len(way) - 1)]
    while spans:
        first, last = spans.pop()
        along = way[last] - way[first]
        length = float(np.hypot(*along))
        offset = way[first + 1 : last] - way[first]
        if not len(offset):
            continue
        across = np.abs(offset @ [-along[1], along[0]]) / length if length > 0 else np.hypot(*offset.T)
        worst = int(np.argmax(across))
        if across[worst] > TOLERANCE:
            middle = first + 1 + worst
            keep[middle] = True
            spans += [(first, middle), (middle, last)]
    return way[keep]


def _extended(way: Array) -> Array:
    """A way that goes on straight at both ends."""
    before, after = _outwards(way), _outwards(way[::-1])
    return np.concatenate([way[:1] + BEYOND * before, way, way[-1:] + BEYOND * after])


def _outwards(way: Array) -> Array:
    """Unit direction in which a way leaves its first place, by its first END metres."""
    far = np.hypot(*(way - way[0]).T)
    other = way[int(np.argmax(far >= END))] if far.max() >= END else way[int(np.argmax(far))]
    return np.asarray((way[0] - other) / np.hypot(*(way[0] - other)), dtype=np.float64)
