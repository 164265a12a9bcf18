"""Snow that lies on surfaces. Paper, supplement "Metaball-based surface snow" and "Material blending".

Snow falls from above: its height H is a field over a surface's horizontal coordinates (x, z), whatever its own height.
Three cascades of metaballs lie on lattices of the world, a vehicle's snow on those of its own frame. Two conventions:

physical
    H = D (1 - b + b sum_l 0.7^l sum_i a_i (1 - r^2 / rho_l^2)^3 / mean): the mean over level ground is the depth D in
    metres, of which the share b lies in bumps.
    Coverage (1 - exp(-H / h_c))^gamma.
paper
    H = D sum_l 0.7^l sum_i a_i W(r, rho_l) with Poly6 as printed, D a mere number; coverage
    sigma(0.8 (H - 0.03))^gamma, which is 0.53 where there is no snow.

Either is times a gate that closes on steep surfaces. The coverage of a point depends on nothing but the point.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reference_numpy.noise import hash2, value_noise
from reference_numpy.ramps import smoothstep
from reference_numpy.sampling import rays
from reference_numpy.world import BLOCK, cells_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Cells a block of each cascade: 0.4, 0.27 and 0.18 m. A ball's radius rho_l = 0.5 / 1.5^l m is 1.25 cells, and its
# centre at most 0.75 cells from its cell's: the 4x4 cells whose centres are nearest to a point hold every ball that
# reaches it, since all other centres are 2 cells away or more along one axis.
CELLS = (400, 600, 900)
RADIUS, JITTER = 1.25, 0.75  # in cells
AMPLITUDE = (1.0, 0.7, 0.49)
SEEDS = (0x51, 0x52, 0x53)
BALLS = np.pi / 4 * RADIUS**2  # mean over the plane of the sum of one cascade's kernels
POLY6 = 315 / (64 * np.pi)  # W(0, rho) rho^3
WEIGHT, BIAS = 0.8, 0.03  # of the printed blend

PATCHES = (50, 100, 200)  # cells a block of the noise that thins the snow on the road: 3.2, 1.6 and 0.8 m
PATCH_SEEDS = (0x61, 0x62, 0x63)
PATCH_LOW, PATCH_HIGH = 0.3, 0.7
EDGE = 0.08  # [m] half the width over which a rut's side rises
SHOULDER = 0.5  # [m] beyond the ruts, over which the untouched snow begins
NEARER = 1.001  # a piece must be this much nearer, squared, to say on which side a place lies: ways may fold back
WOBBLE = 0.1  # [m] that ruts wander to either side


def metaballs(x: Array, z: Array, block: ArrayLike) -> tuple[Array, Array, Array]:
    """Sums of the kernels of each cascade, (3, ...), and their slopes along x and z [1/m].

    Parameters
    ----------
    x, z
        (...) places [m] from the corner of the block.
    block
        (2,) numbers of the block along x and z.
    """
    sums, along_x, along_z = np.zeros((3, 3, *np.shape(x)))
    column_block, row_block = (int(number) for number in np.asarray(block))
    for level, (cells, seed) in enumerate(zip(CELLS, SEEDS, strict=True)):
        # Half a cell further on, so that the cells around are those of the four nearest centres.
        half = BLOCK / cells / 2
        column, u = cells_of(x - half, column_block, cells)
        row, w = cells_of(z - half, row_block, cells)
        for j in range(-1, 3):
            for i in range(-1, 3):
                dx, dz, weight = _ball(column + i, row + j, u - i, w - j, seed)
                inside = np.maximum(1 - (dx * dx + dz * dz) / RADIUS**2, 0)
                sums[level] += weight * inside**3
                steep = weight * inside**2 * (-6 / RADIUS**2 * cells / BLOCK)
                along_x[level] += steep * dx
                along_z[level] += steep * dz
    return sums, along_x, along_z


def _ball(column: NDArray[np.int64], row: NDArray[np.int64], u: Array, w: Array, seed: int) -> tuple[Array, ...]:
    """How far beyond a cell's ball places lie [cells], and the ball's weight in [0.8, 1.2]."""
    h = hash2(column, row, seed)
    aside, along, heavy = (
        (h >> np.uint32(shift) & np.uint32(mask)) for shift, mask in ((0, 2047), (11, 2047), (22, 1023))
    )
    dx = u - JITTER * (aside / 1024.0 - 1)
    dz = w - JITTER * (along / 1024.0 - 1)
    return dx, dz, 0.8 + heavy.astype(np.float64) * (0.4 / 1023)


def patches(x: Array, z: Array, block: ArrayLike) -> tuple[Array, Array]:
    """Noise of metres' size, 0 to 1, that thins the snow on the road, and the largest octave of it alone."""
    column_block, row_block = (int(number) for number in np.asarray(block))
    octaves = []
    for cells, seed in zip(PATCHES, PATCH_SEEDS, strict=True):
        column, u = cells_of(x, column_block, cells)
        row, w = cells_of(z, row_block, cells)
        octaves.append(value_noise(column, row, u, w, seed))
    fbm = (4 * octaves[0] + 2 * octaves[1] + octaves[2]) / 7
    return smoothstep(0.0, 1.0, (fbm - PATCH_LOW) / (PATCH_HIGH - PATCH_LOW)), octaves[0]


def kept_in_tracks(
    x: Array,
    z: Array,
    wobble: Array,
    *,
    track_segment: Array,
    track_path: NDArray[np.int32],
    track_gauge_m: float,
    track_width_m: float,
    track_share: float,
    track_middle: float,
) -> Array:
    """Share of the snow that vehicles have left, 1 where none drove.

    Parameters
    ----------
    x, z
        (...) places [m] from the corner of the camera's block.
    wobble
        (...) how far the ruts wander aside there [m].
    track_segment
        (n, 7) straight pieces of the vehicles' ways: middle x and z, each with what rounding took off it [m],
        direction x and z, half the length [m].
    track_path
        (paths + 1,) where each vehicle's pieces begin, and the end.
    """
    kept = np.ones(np.shape(x))
    for first, last in pairwise(track_path):
        nearest, side = np.full(np.shape(x), np.inf), np.ones(np.shape(x))
        for mx, mx_lo, mz, mz_lo, tx, tz, half in track_segment[first:last]:
            qx, qz = x - (mx + mx_lo), z - (mz + mz_lo)
            beyond = np.maximum(np.abs(qx * tx + qz * tz) - half, 0)
            across = qx * tz - qz * tx
            distance = np.hypot(across, beyond)
            clearly = distance**2 * NEARER < nearest**2
            side = np.where(clearly, np.where(across < 0, -1.0, 1.0), side)
            nearest = np.minimum(nearest, distance)
        aside = np.abs(side * nearest + wobble) - track_gauge_m / 2
        rut = 1 - smoothstep(0.0, 1.0, (np.abs(aside) - track_width_m / 2 + EDGE) / (2 * EDGE))
        lane = 1 - smoothstep(0.0, 1.0, aside / SHOULDER)
        kept = np.minimum(kept, (1 - (1 - track_share) * rut) * (1 - (1 - track_middle) * lane))
    return kept


def gate(n_up: Array, *, up_flat: float, up_steep: float) -> Array:
    """Share of the snow that stays on a slope, by its normal's component upwards: 0 to `up_steep`, 1 from `up_flat`."""
    return smoothstep(0.0, 1.0, (n_up - up_steep) / (up_flat - up_steep))


def coverage(height: Array, *, cover_cm: float, gamma: float, convention: str) -> Array:
    """Share of the surface that a height [m] of snow hides."""
    if convention == "paper":
        return np.asarray((1 / (1 + np.exp(-WEIGHT * (height - BIAS)))) ** gamma, dtype=np.float64)
    return np.asarray((-np.expm1(-height / (cover_cm / 100))) ** gamma, dtype=np.float64)


def bareness(height: Array, *, cover_cm: float, gamma: float, convention: str) -> Array:
    """1 less the coverage, to all its digits where next to nothing is bare."""
    with np.errstate(divide="ignore"):  # no snow hides nothing: the logarithm of 0
        if convention == "paper":
            log_c = -np.log1p(np.exp(-WEIGHT * (height - BIAS)))
        else:
            log_c = np.log1p(-np.exp(-height / (cover_cm / 100)))
    return np.asarray(-np.expm1(gamma * log_c), dtype=np.float64)


def lying(
    point: Array,
    *,
    road: Mask,
    vehicle: NDArray[np.int32],
    footprint2: Array,
    vehicle_row: NDArray[np.int32],
    vehicle_block: NDArray[np.int32],
    vehicle_frame: Array,
    vehicle_kept: Array,
    track_segment: Array,
    track_path: NDArray[np.int32],
    depth_cm: float,
    bumps: float,
    road_share: float,
    road_bare: float,
    track_gauge_m: float,
    track_width_m: float,
    track_share: float,
    track_middle: float,
    convention: str,
) -> tuple[Array, Array]:
    """Height of the snow that falls on places, (n,), and its slope in the camera's frame, (n, 3).

    Parameters
    ----------
    point
        (n, 3) places, camera frame [m].
    road, vehicle
        (n,) whether it is road, and which vehicle it belongs to.
    footprint2
        (n,) square of the footprint of its pixel [m^2]: bumps smaller than that are left out of the slope, where they
        would flicker.

    The others are those of `snow_cover`.
    """
    height, slope = np.zeros(len(point)), np.zeros((len(point), 3))
    known = vehicle_row[np.minimum(vehicle, len(vehicle_row) - 1)]
    row = np.where(vehicle < len(vehicle_row), known, 0)
    for number in np.unique(row):
        here = row == number
        R, R_lo, eye, eye_lo = np.split(np.asarray(vehicle_frame[number]), [9, 18, 21])
        R = (R + R_lo).reshape(3, 3)
        x, _, z = np.moveaxis(point[here] @ R.T + (eye + eye_lo), -1, 0)
        sums, along_x, along_z = metaballs(x, z, vehicle_block[number])
        ground = np.full(x.shape, depth_cm / 100 * vehicle_kept[number])
        on_road = road[here] & (vehicle[here] == 0)
        if number == 0:
            x, z = x[on_road], z[on_road]
            thin, octave = patches(x, z, vehicle_block[0])
            ground[on_road] *= (
                road_share
                * (1 - road_bare * (1 - thin))
                * kept_in_tracks(
                    x,
                    z,
                    WOBBLE * (2 * octave - 1),
                    track_segment=track_segment,
                    track_path=track_path,
                    track_gauge_m=track_gauge_m,
                    track_width_m=track_width_m,
                    track_share=track_share,
                    track_middle=track_middle,
                )
            )
        amplitudes = _amplitudes(convention == "paper")
        height[here] = ground * (1 - bumps + bumps * (amplitudes @ sums))
        shown = ground * bumps * amplitudes[:, None] / (1 + 4 * footprint2[here] / _radii()[:, None] ** 2) ** 2
        slope[here] = (shown * along_x).sum(axis=0)[:, None] * R[0] + (shown * along_z).sum(axis=0)[:, None] * R[2]
    return height, slope


def snow_cover(
    *,
    depth: Array,
    normal: Array,
    albedo: Array,
    roughness: Array,
    metallic: Array,
    sky: Mask,
    road: Mask,
    vehicle: NDArray[np.int32],
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    up: Array,
    vehicle_row: NDArray[np.int32],
    vehicle_block: NDArray[np.int32],
    vehicle_frame: Array,
    vehicle_kept: Array,
    track_segment: Array,
    track_path: NDArray[np.int32],
    depth_cm: float,
    bumps: float,
    cover_cm: float,
    gamma: float,
    up_flat: float,
    up_steep: float,
    max_slope: float,
    snow_albedo: tuple[float, float, float],
    snow_roughness: float,
    road_share: float,
    road_bare: float,
    track_gauge_m: float,
    track_width_m: float,
    track_share: float,
    track_middle: float,
    displacement: bool,
    convention: str,
) -> dict[str, Array]:
    """Let snow lie.

    Parameters
    ----------
    depth
        (H, W) z of the surfaces [m], > 0.
    normal
        (H, W, 3) unit, camera frame, facing the camera.
    albedo, roughness, metallic
        (H, W, 3), (H, W) and (H, W), all 0 to 1.
    sky, road
        (H, W) masks.
    vehicle
        (H, W) vehicle of every pixel, 0 for none.
    fx, fy, cx, cy
        Intrinsics [px].
    up
        (3,) the world's up in the camera's frame.
    vehicle_row
        (ids,) by the number in `vehicle`: its row in the tables below; 0, and ids beyond, is the world.
    vehicle_block
        (n, 2) numbers of the blocks that the frames' origins lie in, along x and z.
    vehicle_frame
        (n, 24) of each frame: rotation from the camera, what rounding took off it, the camera's place in the frame [m],
        and what rounding took off that.
    vehicle_kept
        (n,) share of the snow that stays.
    track_segment, track_path
        Ways of the vehicles, see `kept_in_tracks`.
    bumps
        Share of the depth that lies in bumps, 0 to 1.
    up_flat, up_steep
        Cosines of the slopes up to which all snow stays and from which on none does.

    The others are those of `aw4d.params.SnowCoverParams`.

    Returns
    -------
    dict
        `albedo`, `normal` (H, W, 3), `depth`, `roughness`, `metallic`, `snow_coverage` and `snow_bare`, 1 less that,
        (H, W), and `snow_height` (H, W) [m], measured upwards.
    """
    ray, stretch = rays(depth.shape, fx=fx, fy=fy, cx=cx, cy=cy)
    point = ray * (stretch * depth)[..., None]
    n_up = normal @ np.asarray(up)
    n_point = np.einsum("...c,...c->...", normal, point)
    open_to_snow = np.where(sky, 0, gate(n_up, up_flat=up_flat, up_steep=up_steep))
    grazing2 = np.einsum("...c,...c->...", point, point) / np.maximum(n_point**2, 1e-12)
    seen = open_to_snow > 0

    height, slope = np.zeros(depth.shape), np.zeros((*depth.shape, 3))
    height[seen], slope[seen] = lying(
        point[seen],
        road=road[seen],
        vehicle=vehicle[seen],
        footprint2=((depth / fx) ** 2 * grazing2)[seen],
        vehicle_row=vehicle_row,
        vehicle_block=vehicle_block,
        vehicle_frame=vehicle_frame,
        vehicle_kept=vehicle_kept,
        track_segment=track_segment,
        track_path=track_path,
        depth_cm=depth_cm,
        bumps=bumps,
        road_share=road_share,
        road_bare=road_bare,
        track_gauge_m=track_gauge_m,
        track_width_m=track_width_m,
        track_share=track_share,
        track_middle=track_middle,
        convention=convention,
    )
    covered = coverage(height, cover_cm=cover_cm, gamma=gamma, convention=convention) * open_to_snow
    slips = np.where(sky, 1, gate(up_flat + up_steep - n_up, up_flat=up_flat, up_steep=up_steep))
    bare = slips + bareness(height, cover_cm=cover_cm, gamma=gamma, convention=convention) * open_to_snow
    bare = np.where(covered == 0, 1, bare)  # the sum is rounded; what no snow lies on keeps its bits
    height = height * open_to_snow
    share = covered[..., None]
    return {
        "albedo": share * np.asarray(snow_albedo) + bare[..., None] * albedo,
        "normal": _tilted(normal, slope, covered, 1 / max_slope**2 + grazing2),
        "roughness": covered * snow_roughness + bare * roughness,
        "metallic": metallic * bare,
        "depth": depth * (1 - _raised(height * n_up, n_point)) if displacement else depth,
        "snow_coverage": covered,
        "snow_bare": bare,
        "snow_height": height,
    }


def _radii() -> Array:
    """Of the cascades' balls [m]."""
    return RADIUS * BLOCK / np.asarray(CELLS, dtype=np.float64)


def _amplitudes(paper: bool) -> Array:
    """Of the cascades, (3,), for a depth of 1."""
    amplitude = np.asarray(AMPLITUDE)
    return amplitude * POLY6 / _radii() ** 3 if paper else amplitude / (amplitude.sum() * BALLS)


def _tilted(normal: Array, slope: Array, covered: Array, flatness2: Array) -> Array:
    """Normals tilted against the part of the slope that lies in the surface, by the coverage.

    The slope is clamped smoothly, under 1 / sqrt(flatness2): a bump that is steeper than the view upon it hides its
    far side, so that every normal keeps to the camera's side.
    """
    across = slope - normal * np.einsum("...c,...c->...", normal, slope)[..., None]
    steep2 = np.einsum("...c,...c->...", across, across)
    tilt = covered / np.sqrt(1 + steep2 * flatness2)
    tilted = normal - tilt[..., None] * across
    length = np.sqrt(np.einsum("...c,...c->...", tilted, tilted))
    return np.where((covered > 0)[..., None], tilted / np.maximum(length, 1e-18)[..., None], normal)


def _raised(thickness: Array, n_point: Array) -> Array:
    """Share of the depth that a layer of some thickness [m] along the normal takes off it, at most a quarter."""
    return thickness / np.maximum(np.abs(n_point), np.maximum(4 * thickness, 1e-12))
