"""What falls through the air: where each particle is in a frame, how it shows, what lights it, and how all are blended.

A particle is drawn as an uneven capsule, the way that it moves while the shutter is open, seen through the lens. Its
edge is soft, `(1 - (d / rho)^2)^4` of the distance d to the axis, and at least about a pixel wide. The opacity A of
the axis is such that the picture's sum of opacity is that of the particle: its disc, for as long as it is seen. So the
light that it adds depends neither on the resolution nor on the blur.

Particles are blended in the order of their depth; a place in that order, and all that follows from an order, is taken
from a depth rounded to float32, which every device finds alike.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from reference_numpy.environment import prefiltered
from reference_numpy.lamp import DIRECTIONAL, EPSILON, lamp
from reference_numpy.noise import hash2
from reference_numpy.phase import henyey_greenstein
from reference_numpy.ramps import smoothstep

Array = NDArray[np.float64]

CLASSES = 1024  # particle i is of class i modulo CLASSES
UNITS = 2**31  # places in a box
KEYS = 2**16  # steps of depth by which particles are put in order
SOFT_PX = 1.4  # radius at which a particle without size ends: half as wide at half of its opacity
DISC, BLUR = 5.0, 3.0  # rho^2 of a disc's radius squared, and of a blurred point's: as bright in the middle, as wide
ACROSS, AROUND = 256 / 315, np.pi / 5  # of (1 - x^2)^4: its integral over -1 to 1, and over the unit disc
FADE_NEAR, FADE_FAR = 0.5, 0.36  # shares of the nearest depth, of the reach squared, over which particles fade in
BEHIND = 0.01  # share of the surface's depth over which a particle sinks into it
COVERED = 4.0  # slope of the step at half of a pixel that is covered


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
    box = (drawn + np.asarray(at)[kind, :3].astype(np.int64)) % UNITS + np.asarray(corner).astype(np.int64)
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


def in_order(depth: NDArray[np.float32], steps: float) -> NDArray[np.int64]:
    """Numbers of particles from the nearest to the farthest, those of one of the `steps` a metre by their number."""
    key = np.minimum(depth * np.float32(steps), np.float32(KEYS - 1)).astype(np.uint32)
    return np.argsort(key, kind="stable")


def colors(
    place: Array,
    *,
    lobe: float,
    g: float,
    env_rotation: Array,
    env_specular: Array,
    sun_direction: Array,
    sun_irradiance: Array,
    light_kind: NDArray[np.int32],
    light_position: Array,
    light_direction: Array,
    light_intensity: Array,
    light_cos_inner: Array,
    light_cos_outer: Array,
    light_r_max: Array,
    haze_extinction: float,
    haze_color: Array,
) -> Array:
    """Radiance of particles at some places, (N, 3) camera frame [m], through the haze; (N, 3).

    What is seen through a particle is its surroundings, blurred (`lobe`: the roughness of `prefiltered`); every lamp
    and the sun add E p, the light that falls on it times the phase function (Henyey and Greenstein's, of `g`).
    """
    distance = np.sqrt((place**2).sum(axis=1))
    view = place / np.maximum(distance, 1e-9)[:, None]
    seen = prefiltered(env_specular, view @ np.asarray(env_rotation).T, np.full(len(place), lobe))
    seen += henyey_greenstein(view @ sun_direction, g=g)[:, None] * sun_irradiance
    for i in range(len(light_kind)):
        if light_kind[i] == DIRECTIONAL:
            direction = light_direction[i] / np.linalg.norm(light_direction[i])
            falls = henyey_greenstein(-(view @ direction), g=g)
        else:
            source = lamp(
                i,
                light_kind=light_kind,
                light_position=light_position,
                light_direction=light_direction,
                light_cos_inner=light_cos_inner,
                light_cos_outer=light_cos_outer,
                light_r_max=light_r_max,
            )
            to_lamp = source.position - place
            d2 = (to_lamp**2).sum(axis=1)
            to_lamp /= np.sqrt(np.maximum(d2, 1e-18))[:, None]
            mu = np.einsum("nc,nc->n", view, to_lamp)
            light = source.cone(-(to_lamp @ source.direction)) * source.window(d2) / (d2 + EPSILON)
            falls = light * henyey_greenstein(mu, g=g)
        seen += falls[:, None] * light_intensity[i]
    left = np.exp(-haze_extinction * distance)[:, None]
    return left * seen - np.expm1(-haze_extinction * distance)[:, None] * np.asarray(haze_color)


def blend(
    drops: Capsules, color: Array, *, rgb: Array, depth: Array, sky: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Particles, from the nearest to the farthest, before a picture.

    Parameters
    ----------
    drops, color
        Particles in order, and their colours, (N, 3).
    rgb, depth, sky
        The picture, (H, W, 3), (H, W) z of its surfaces [m], (H, W) True where there is none.

    Returns
    -------
    rgb, alpha, depth
        (H, W, 3); (H, W) share that particles hide; (H, W) depth of the nearest particle that covers half of the pixel,
        or of the surface [m].
    """
    height, width = depth.shape
    light, alpha = np.zeros((height, width, 3)), np.zeros((height, width))
    taken, log_nearest = np.zeros((height, width)), np.zeros((height, width))
    surface = np.where(sky, np.inf, np.maximum(depth, 1e-3))
    for i in range(len(color)):
        ends, wide = np.stack([drops.head[i], drops.tail[i]]), max(drops.head_radius[i], drops.tail_radius[i])
        first = np.maximum(np.floor(ends.min(axis=0) - wide), 0).astype(int)
        last = np.minimum(np.ceil(ends.max(axis=0) + wide), (width - 1, height - 1)).astype(int)
        if (last < first).any():
            continue
        at = np.s_[first[1] : last[1] + 1, first[0] : last[0] + 1]
        v, u = np.mgrid[at]
        z = float(drops.depth[i])
        shows = _profile(drops, i, u, v) * smoothstep(0.0, 1.0, (1 - z / surface[at]) / BEHIND)
        a = drops.opacity[i] * shows
        covers = np.clip((drops.covers[i] * shows - 0.5) * COVERED + 0.5, 0.0, 1.0)
        left = (1 - alpha[at]) * a
        light[at] += left[..., None] * color[i]
        alpha[at] += left
        log_nearest[at] += (1 - taken[at]) * covers * np.log(z)
        taken[at] += (1 - taken[at]) * covers
    # Where half of a pixel is just about covered, the depth is between the two, by its logarithm.
    between = np.exp(log_nearest + (1 - taken) * np.log(np.where((taken > 0) & (taken < 1), depth, 1.0)))
    return light + (1 - alpha)[..., None] * rgb, alpha, np.where(taken > 0, between, depth)


def _profile(drops: Capsules, i: int, u: NDArray[np.int64], v: NDArray[np.int64]) -> Array:
    """(1 - (d / rho)^2)^4 of pixels, d being the distance to the axis and rho the radius beside it."""
    from_head = np.stack([u - drops.head[i, 0], v - drops.head[i, 1]], axis=-1)
    axis = drops.tail[i] - drops.head[i]
    along = np.clip(from_head @ axis / max(float(axis @ axis), 1e-30), 0.0, 1.0)
    off = from_head - along[..., None] * axis
    rho = drops.head_radius[i] + along * (drops.tail_radius[i] - drops.head_radius[i])
    out: Array = np.maximum(1 - (off**2).sum(axis=-1) / rho**2, 0.0) ** 4
    return out


def in_front(drops: Capsules, width: int, height: int) -> NDArray[np.bool_]:
    """Which particles can show in a picture of that size."""
    wide = np.maximum(drops.head_radius, drops.tail_radius)[:, None]
    low, high = np.minimum(drops.head, drops.tail) - wide, np.maximum(drops.head, drops.tail) + wide
    inside = ((high > 0) & (low < (width - 1, height - 1))).all(axis=1)
    seen: NDArray[np.bool_] = inside & (drops.opacity > 0)
    return seen
