"""Where the particles that fall through the air are in a frame, and how each of them shows.

A particle is drawn as an uneven capsule, the way that it moves while the shutter is open, seen through the lens. Its
edge is soft, `(1 - (d / rho)^2)^4` of the distance d to the axis, and at least about a pixel wide. The opacity A of
the axis is such that the picture's sum of opacity is that of the particle: its disc, for as long as it is seen. So the
light that it adds depends neither on the resolution nor on the blur.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from reference_numpy.noise import hash2
from reference_numpy.ramps import smoothstep

Array = NDArray[np.float64]

CLASSES = 1024  # particle i is of class i modulo CLASSES
UNITS = 2**31  # places in a box
SOFT_PX = 1.4  # radius at which a particle without size ends: half as wide at half of its opacity
DISC, BLUR = 5.0, 3.0  # rho^2 of a disc's radius squared, and of a blurred point's: as bright in the middle, as wide
ACROSS, AROUND = 256 / 315, np.pi / 5  # of (1 - x^2)^4: its integral over -1 to 1, and over the unit disc
FADE_NEAR, FADE_FAR = 0.5, 0.36  # shares of the nearest depth, of the reach squared, over which particles fade in


@dataclass(kw_only=True)
class Capsules:
    """Particles as they show, (N,) or (N, C); `take` keeps some of them.

    Parameters
    ----------
    place
        (N, 3) camera frame [m], amid the exposure.
    depth
        Its z as float32.
    head, tail
        (N, 2) ends of the axis in the picture [px].
    head_radius, tail_radius
        rho at the ends [px].
    opacity
        A, on the axis.
    covers
        Share of a pixel on the axis that the particle covers as it passes.
    """

    place: Array
    depth: NDArray[np.float32]
    head: Array
    tail: Array
    head_radius: Array
    tail_radius: Array
    opacity: Array
    covers: Array

    def take(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> Capsules:
        """Those of a mask or of some numbers, in their order."""
        return Capsules(**{held.name: getattr(self, held.name)[which] for held in fields(self)})


def places(
    count: int, at: NDArray[np.uint32], corner: NDArray[np.int32], axes: Array, seed: int
) -> tuple[NDArray[np.int64], Array]:
    """Classes of the particles, (N,), and their places in the scale of the longest reach, (N, 3), camera frame [m].

    Parameters
    ----------
    count
        Number of particles N.
    at, corner, axes
        How the boxes lie, see `aw4d.world.falling.particle_arguments`.
    seed
        By which places are drawn.
    """
    i = np.arange(count)
    kind = i % CLASSES
    drawn = np.stack([hash2(i, [axis], seed) >> np.uint32(1) for axis in range(3)], axis=1).astype(np.int64)
    box = (drawn + np.asarray(at)[:, kind].T.astype(np.int64)) % UNITS + np.asarray(corner).astype(np.int64)
    place: Array = box.astype(np.float64) @ np.asarray(axes).reshape(3, 3).T
    return kind, place


def capsules(
    kind: NDArray[np.int64],
    place: Array,
    *,
    move: Array,
    taper: float,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    near_m: float,
    reach_m: float,
    opacity: float,
    aperture_mm: float,
    focus_m: float,
    convention: str,
) -> Capsules:
    """How particles show.

    Parameters
    ----------
    kind, place
        Classes and places, as `places` gives them.
    move
        (CLASSES, 8) half of the way during the exposure [m], diameter [m], both in the scale of the longest reach; that
        scale; nothing.
    taper
        Radius of a tail over that of a head.
    fx, fy, cx, cy
        Intrinsics [px].
    near_m, reach_m
        Depth and distance between which particles show [m].
    opacity
        Factor on their opacity.
    aperture_mm, focus_m
        Width of the lens' opening, and depth in focus.
    convention
        "physical": a particle covers a place for as long as it takes to pass. "paper": the whole capsule is as opaque.
    """
    half, diameter, scale = move[kind, :3], move[kind, 3], move[kind, 4]
    z = place[:, 2]
    ahead = z > 0
    z = np.where(ahead, z, 1.0)
    clip = np.minimum(1.0, 0.5 * z / np.maximum(np.abs(half[:, 2]), 1e-30))  # what comes nearer the eye is left out
    ends = [place + sign * clip[:, None] * half for sign in (1, -1)]
    head, tail = (
        np.stack([fx * e[:, 0] / e_z + cx, fy * e[:, 1] / e_z + cy], axis=1)
        for e in ends
        for e_z in (np.where(ahead, e[:, 2], 1.0),)
    )
    f = (fx + fy) / 2
    blur = f * aperture_mm * 5e-4 * np.abs(1 / (scale * z) - 1 / focus_m)
    r_head, r_tail, r = (0.5 * f * diameter / np.where(ahead, d, 1.0) for d in (ends[0][:, 2], ends[1][:, 2], z))
    r_tail = r_tail * taper
    rho_head, rho_tail = (np.sqrt(DISC * end**2 + BLUR * blur**2 + SOFT_PX**2) for end in (r_head, r_tail))
    length = np.linalg.norm(head - tail, axis=1)
    drawn = ACROSS * (rho_head + rho_tail) / 2 * length + AROUND * (rho_head**2 + rho_tail**2) / 2
    if convention == "paper":
        seen = (r_head + r_tail) * length + np.pi * (r_head**2 + r_tail**2) / 2
    else:
        seen = np.pi * r**2 * clip
    depth = scale * z
    near = smoothstep(0.0, 1.0, (depth / near_m - 1) / FADE_NEAR)
    far = smoothstep(0.0, 1.0, (1 - (place**2).sum(axis=1) / reach_m**2) / FADE_FAR)
    return Capsules(
        place=scale[:, None] * place,
        depth=depth.astype(np.float32),
        head=head,
        tail=tail,
        head_radius=rho_head,
        tail_radius=rho_tail,
        opacity=np.where(ahead, np.minimum(opacity * seen / drawn, 1.0) * near * far, 0.0),
        covers=np.minimum(1.0, 4 * r / (rho_head + rho_tail)) * near * far,
    )


def in_front(drops: Capsules, width: int, height: int) -> NDArray[np.bool_]:
    """Which particles can show in a picture of that size."""
    wide = np.maximum(drops.head_radius, drops.tail_radius)[:, None]
    low, high = np.minimum(drops.head, drops.tail) - wide, np.maximum(drops.head, drops.tail) + wide
    inside = ((high > 0) & (low < (width - 1, height - 1))).all(axis=1)
    seen: NDArray[np.bool_] = inside & (drops.opacity > 0)
    return seen
