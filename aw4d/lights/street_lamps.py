"""Street lamps of a clip, where it has masks of them: a spot at the head of each, looking down."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from aw4d import cache
from aw4d.clip import Clip
from aw4d.gbuffer import GBuffer
from aw4d.lights import clusters
from aw4d.lights.clusters import components
from aw4d.lights.light import Light
from aw4d.lights.photometry import on_picture
from aw4d.params import StreetLampParams

Points = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

LINK = 0.5  # [m] single linkage, paper
TOP = 0.05  # share of a lamp's points, the highest, that are its head: paper
GRAIN = 0.05  # [m] cells of which one point counts, however often and from however near they are seen
FEWEST = 12  # cells under which a component is no lamp
APART = 3.0  # [m] in plan; of nearer components the highest is the head, the others are its post
MARGIN = 2  # [px] from the picture's border within which a lamp goes on outside of it
HIDDEN = 0.3  # [m] by which what hides a lamp is nearer than it
PLANES = ("depth", "sky", "street_light")


@dataclass(frozen=True, eq=False)
class _Seen:
    """Points on lamps, one row each."""

    points: Points  # (N, 3) world [m]
    frame: Index
    ends: Mask  # the lamp ends above this point
    cut: Mask  # something hides what is above it, or the picture ends


def _grains(points: Points) -> tuple[Index, Index]:
    """Indices of the first point in every cell, and the cell that each point is in."""
    cell = np.floor((points - points.min(axis=0)) / GRAIN).astype(np.int64)
    key = (cell[:, 0] * (cell[:, 1].max() + 1) + cell[:, 1]) * (cell[:, 2].max() + 1) + cell[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse


def _is_whole(frame: Index, ends: Mask, cut: Mask) -> bool:
    """Whether some frame shows the upper end of a lamp, by the points at its top."""
    if not cut.any():
        return True
    number = np.unique(frame, return_inverse=True)[1]
    return bool((np.bincount(number, ends) > 2 * np.bincount(number, cut)).any())


def _heads(seen: _Seen) -> Points:
    """Heads of the lamps, (L, 3), without those that are cut off."""
    if not len(seen.points):
        return np.zeros((0, 3))
    first, cell = _grains(seen.points)
    of_cell = components(seen.points[first], LINK)
    of_point = of_cell[cell]
    heads = []
    for number in np.flatnonzero(np.bincount(of_cell) >= FEWEST):
        lamp = seen.points[first[of_cell == number]]
        level = np.quantile(lamp[:, 1], 1 - TOP)
        top = (of_point == number) & (seen.points[:, 1] >= level)
        if _is_whole(seen.frame[top], seen.ends[top], seen.cut[top]):
            heads.append((int(first[of_cell == number].min()), *lamp[lamp[:, 1] >= level].mean(axis=0)))
    return _highest(np.array(sorted(heads)).reshape(-1, 4)[:, 1:])


def _highest(heads: Points) -> Points:
    """Heads without those that stand within 3 m, in plan, of a higher one."""
    offset = heads[:, None, ::2] - heads[None, :, ::2]
    near = np.einsum("ijk,ijk->ij", offset, offset) < APART**2
    lower = near & (heads[:, None, 1] < heads[None, :, 1])
    return np.asarray(heads[~lower.any(axis=1)], dtype=np.float64)


def lamp_positions(points: Points) -> Points:
    """Heads of the lamps that surface points belong to.

    Components at 0.5 m, and of each the centroid of the highest 5 % of its surface (paper, "Light Source
    Implementation").

    Parameters
    ----------
    points
        World points on lamps [m], y up, (N, 3), seen in any number of frames.

    Returns
    -------
    (L, 3) [m], in the order in which the lamps first appear among the points. Components under 12 cells of 5 cm are no
    lamps, and of components that stand within 3 m of each other only the highest is one.
    """
    p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    nowhere = np.zeros(len(p), np.bool_)
    return _heads(_Seen(p, np.zeros(len(p), np.int64), nowhere, nowhere))


def _mask_points(frame: GBuffer, index: int) -> _Seen:
    """Points of a frame's lamps."""
    camera, depth = frame.camera, frame["depth"].astype(np.float64)
    lamp = (frame["street_light"] > 0) & ~frame["sky"]
    rows, columns = np.nonzero(lamp)
    z = depth[rows, columns]
    ray = np.stack([columns, rows, np.ones(len(rows))], axis=-1) @ np.linalg.inv(camera.K).T
    above = np.maximum(rows - 1, 0)
    edge = ~lamp[above, columns]
    outside = (rows < MARGIN) | (columns < MARGIN) | (columns >= camera.width - MARGIN)
    cut = outside | (edge & (depth[above, columns] < z - HIDDEN))
    return _Seen(camera.to_world(ray * z[:, None]), np.full(len(z), index), edge & ~cut, cut)


def street_lamps(clip: Clip, params: StreetLampParams, *, white_cd_m2: float) -> list[Light]:
    """Spots at the heads of the lamps in the clip's `street_light` masks, "street-1", "street-2", ...

    A lamp whose head no frame shows whole is left out.

    Parameters
    ----------
    clip
        A clip; without the planes `depth` and `street_light` it has no lamps.
    params
        Strength, cone and the step in which frames are searched.
    white_cd_m2
        The luminance that the picture shows as white.
    """
    if not set(PLANES) <= set(clip.planes):
        return []
    key = (cache.source_of(sys.modules[__name__], clusters), clip.stamp(PLANES), params.every)
    heads = cache.kept("lamps", key, lambda: {"heads": _search(clip, params.every)})["heads"]
    return spots(heads, params, white_cd_m2=white_cd_m2, name="street")


def _search(clip: Clip, every: int) -> Points:
    """Heads of the lamps in every so many frames."""
    found = [_mask_points(clip.frame(index, PLANES), index) for index in range(0, len(clip), every)]
    seen = _Seen(*(np.concatenate([getattr(part, f.name) for part in found]) for f in fields(_Seen)))
    return _heads(seen)


def spots(heads: Points, params: StreetLampParams, *, white_cd_m2: float, name: str) -> list[Light]:
    """A spot that looks down at each head, (L, 3) world [m], named `name`-1, `name`-2, ..."""
    intensity = on_picture(params.candela, params.color, white_cd_m2)
    return [
        Light(
            kind="spot",
            position=(float(x), float(y), float(z)),
            direction=(0.0, -1.0, 0.0),
            intensity=intensity,
            inner_deg=params.inner_deg,
            outer_deg=params.outer_deg,
            r_max_m=params.r_max_m,
            name=f"{name}-{number}",
        )
        for number, (x, y, z) in enumerate(heads, start=1)
    ]
