"""Puddles on the road, anchored to the world. Paper, supplement "Geometry-Anchored Puddle Modeling".

N is fractal noise of the world's level plane; M, how far a place is under water, 0 to 1:

physical
    M = s((N - level) / shore + 1/2), s(t) = t^2 (3 - 2 t) on [0, 1], times how level the road is and how free of snow.
    Roughness goes to 0, the normal to the world's up, and of the ground's albedo is seen A exp(-tau / mu'), mu' the
    cosine of the refracted ray.
paper
    M = smoothstep(0.2, 1, smoothstep(0, 0.7, N)) on the road; roughness goes to 0, and that is all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.fbm import fbm
from reference_numpy.ramps import smoothstep
from reference_numpy.sampling import rays
from reference_numpy.wet_ground import unit_normals
from reference_numpy.world import places

Array = NDArray[np.float64]

WATER_INDEX = 1.333  # of refraction


def printed_mask(noise: Array) -> Array:
    """Under water, 0 to 1, as printed; noise of amplitudes 1/2, 1/4, 1/8."""
    return smoothstep(0.2, 1.0, smoothstep(0.0, 0.7, noise))


def levelness(normal: Array, up: Array, flat: float, steep: float) -> Array:
    """1 where the squared sine of the slope is at most `flat`, 0 where it is `steep`, or the surface hangs over."""
    across = np.cross(unit_normals(normal), up)
    sin2 = np.einsum("...c,...c->...", across, across)
    stands = np.einsum("...c,...c->...", normal, np.broadcast_to(up, normal.shape)) > 0
    return np.where(stands, 1 - smoothstep(flat, steep, sin2), 0.0)


def puddles(
    *,
    depth: Array,
    normal: Array,
    albedo: Array,
    roughness: Array,
    sky: NDArray[np.bool_],
    road: NDArray[np.bool_],
    snow_bare: Array,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    to_world: Array,
    to_world_lo: Array,
    eye: Array,
    eye_lo: Array,
    block: NDArray[np.int64],
    up: Array,
    cells: int,
    octaves: int,
    weight: Array,
    level: float,
    steepness: float,
    flat: float,
    steep: float,
    optical_depth: float,
    seed: int,
    convention: str,
) -> dict[str, Array]:
    """Put the road under water.

    Parameters
    ----------
    depth
        (H, W) z of the surfaces [m].
    normal, albedo
        (H, W, 3) camera frame, and linear.
    roughness, snow_bare
        (H, W), 0 to 1.
    sky, road
        (H, W) True where the sky is seen, and on drivable ground.
    fx, fy, cx, cy
        Intrinsics [px].
    to_world, to_world_lo, eye, eye_lo, block
        The camera's place: `reference_numpy.world.places`, `cells_of`.
    up
        (3,) the world's up, unit, camera frame.
    cells, octaves, weight, seed
        Of the noise: `reference_numpy.fbm`; cells a block of the first octave, and one weight an octave.
    level, steepness
        Noise at the middle of the shore, and 1 over the noise across a shore.
    flat, steep
        Squared sines of the slopes up to which water stands, and from which on none does.
    optical_depth
        tau of the water, down and up again, seen from above.
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `puddle` (H, W), the M above; `albedo`, `normal` (H, W, 3), `roughness` (H, W).
    """
    view = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    at = places(depth, **view, to_world=to_world, to_world_lo=to_world_lo, eye=eye, eye_lo=eye_lo)
    noise = fbm(at[..., 0], at[..., 2], block=block, cells=cells, weight=np.asarray(weight)[:octaves], seed=seed)
    here = np.asarray(road) & ~np.asarray(sky)
    if convention == "paper":
        puddle = np.where(here, printed_mask(noise), 0.0)
        return {"puddle": puddle, "albedo": albedo, "normal": normal, "roughness": roughness * (1 - puddle)}
    under = smoothstep(0.0, 1.0, (noise - level) * steepness + 0.5)
    puddle = np.where(here, under * levelness(normal, up, flat, steep) * snow_bare, 0.0)
    ray, _ = rays(depth.shape, **view)
    facing = np.clip(-ray @ np.asarray(up), 0.0, 1.0)
    through = np.exp(-optical_depth / np.sqrt(1 - (1 - facing**2) / WATER_INDEX**2))
    share = puddle[..., None]
    water = unit_normals(normal + share * (np.asarray(up) - normal))
    return {
        "puddle": puddle,
        "albedo": albedo * (1 + share * (through[..., None] - 1)),
        "normal": np.where(share > 0, water, normal),
        "roughness": roughness * (1 - puddle),
    }
