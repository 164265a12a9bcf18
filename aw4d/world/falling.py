"""Where what falls is in a frame: a closed form of the seed and the time, anchored to the world, in exact integers.

Particles come in classes, particle i in class i modulo CLASSES. A class has a size, a speed, and a box of the world,
which it fills endlessly, box beside box; of the boxes' images of a particle the one nearest the view is drawn. The box
holds all that the camera sees up to the class' reach, which is proportional to the size: all classes end at the same
apparent size. A particle's place in its box is a hash of its number plus the way that its class has fallen, in units of
2^-31 of the box, modulo 2^31: exact at any time and any place.

The passes take places in the scale of the class with the longest reach; they are then `scale` times as near.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import ClipInfo
from aw4d.params import RainStreaksParams, SnowFallParams
from aw4d.world.sizes import Sizes, drop_speed, rain_sizes, snow_sizes
from reference_numpy.blending import KEYS
from reference_numpy.capsules import CLASSES, UNITS

Array = NDArray[np.float64]

PAPER_HEIGHT_M = 51.0  # of the box in which the paper's drops fall
PAPER_DROPS_MM = (0.5, 6.0)
PAPER_TAPER = 0.7  # of a streak's head over its tail
PAPER_SNOW_SPEED = 2.0  # [m/s]
PAPER_LENGTH = 0.8  # of the frame interval
DROP_LOBE = 5 / 7  # roughness of the blur in which surroundings are seen: a drop gathers half of them, most from ahead
FLAKE_LOBE = 1.0
FLUTTERS = (0.6, 1.4)  # [1/s] how often flakes sway; of the order of Kajikawa 1992
GOLDEN = (0.6180339887498949, 0.7548776662466927, 0.5698402909980532, 0.8191725133961645, 0.6710436067037893)
# Fractions of multiples of these fill the unit interval evenly, and together the unit square (Roberts 2018).


@dataclass(frozen=True, kw_only=True, eq=False)
class Classes:
    """What the classes of particles are, (CLASSES,) each.

    Parameters
    ----------
    count
        Number of particles in all.
    diameter
        [m].
    scale
        Reach of the class over the longest reach, 0 to 1.
    speed
        [m/s] downwards in still air.
    """

    count: int
    diameter: Array
    scale: Array
    speed: Array


def classes(sizes: Sizes, most: int, reach_m: float, volume: float) -> Classes:
    """Classes of what falls: all that is larger to the eye than some angle, the smallest for which `most` suffice.

    Parameters
    ----------
    sizes
        What falls.
    most
        The largest number of particles.
    reach_m
        The longest reach.
    volume
        Of the box of a class with that reach [m3].
    """
    D = sizes.diameter_mm

    def within(angle: float) -> Array:
        return np.asarray(sizes.number * volume * np.minimum(1.0, D / angle) ** 3)

    low, high = D[0], D[-1]  # diameter [mm] of what is seen all the way
    if within(low).sum() > most:
        while within(high).sum() > most:
            high *= 2
        for _ in range(50):
            middle = (low + high) / 2
            low, high = (low, middle) if within(middle).sum() <= most else (middle, high)
        angle = high
    else:
        angle = low
    number = within(angle)
    total = float(number.sum())
    if total == 0:
        return Classes(count=0, diameter=np.zeros(CLASSES), scale=np.ones(CLASSES), speed=np.zeros(CLASSES))
    diameter, speed = (np.interp(_spread(1), np.cumsum(number) / total, of) for of in (D, sizes.speed))
    scale = np.minimum(1.0, diameter / angle)
    return Classes(count=min(round(total), most), diameter=diameter * 1e-3, scale=scale, speed=speed)


def _spread(which: int) -> Array:
    """A number in (0, 1) for every class, evenly spread; independent of those of another `which`."""
    return np.asarray((np.arange(CLASSES) + 0.5) * GOLDEN[which - 1] % 1.0, dtype=np.float64)


def _uniform(limits_mm: tuple[float, float], count: int) -> Classes:
    """Drops of every size alike, all with the same reach."""
    low, high = limits_mm
    diameter = low + _spread(1) * (high - low)
    return Classes(count=count, diameter=diameter * 1e-3, scale=np.ones(CLASSES), speed=drop_speed(diameter))


def view_box(info: ClipInfo, reach_m: float, index: int) -> tuple[Array, Array]:
    """Sides of a box, along the world's axes, that holds what any frame sees up to `reach_m`; its middle in a frame.

    Parameters
    ----------
    info
        Cameras of the clip.
    reach_m
        [m].
    index
        Number of the frame.

    Returns
    -------
    sides, middle
        (3,) [m] each; the middle as seen from the eye, no farther off than half a side.
    """
    margin = 0.1  # of the picture, to every side: streaks reach in from there
    u, v = (np.linspace(-margin, 1 + margin, 9) * size for size in (info.width, info.height))
    pixel = np.stack([*np.meshgrid(u, v), np.ones((9, 9))]).reshape(3, -1)
    ray = np.asarray(info.camera_to_world[:, :3, :3] @ (np.linalg.inv(info.K) @ pixel), dtype=np.float64)
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    corners = 1.05 * reach_m * np.concatenate([ray, np.zeros((len(ray), 3, 1))], axis=2)
    low, high = corners.min(axis=2), corners.max(axis=2)
    return (high - low).max(axis=0), (high[index] + low[index]) / 2


def eye_velocity(info: ClipInfo, index: int) -> Array:
    """Of the camera in the world [m/s], (3,): the central difference of its places; 0 for a single frame."""
    first, last = max(index - 1, 0), min(index + 1, len(info) - 1)
    if first == last:
        return np.zeros(3)
    way = info.camera_to_world[last, :3, 3] - info.camera_to_world[first, :3, 3]
    out: Array = way / (info.times[last] - info.times[first])
    return out


@lru_cache(maxsize=4)
def _gusts(gust_m_s: float) -> Array:
    """Speed of every class beside the wind, (CLASSES, 3): normal along x and z."""
    normal = NormalDist()  # SciPy's takes a tenth of a second to import
    x, z = ([normal.inv_cdf(share) for share in _spread(base).tolist()] for base in (2, 3))
    return gust_m_s * np.stack([x, np.zeros(CLASSES), z], axis=1)


def _flutter(sway_m: float, time: float) -> tuple[Array, Array]:
    """How far every class is off its way [m], and how fast it moves there [m/s], (CLASSES, 3): swings along x and z."""
    low, high = FLUTTERS
    turn = 2 * np.pi * np.stack([low + _spread(4) * (high - low), low + _spread(5) * (high - low)], axis=1)
    angle = turn * time + 2 * np.pi * np.stack([_spread(5), _spread(4)], axis=1)
    none = np.zeros(CLASSES)
    off = sway_m * np.sin(angle)
    speed = sway_m * turn * np.cos(angle)
    return np.stack([off[:, 0], none, off[:, 1]], axis=1), np.stack([speed[:, 0], none, speed[:, 1]], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fall:
    """How the classes move: steady velocity [m/s], then what they are off it [m] and its rate, (CLASSES, 3) each."""

    velocity: Array
    off: Array
    rate: Array


def particle_arguments(
    info: ClipInfo,
    index: int,
    held: Classes,
    fall: Fall,
    reach_m: float,
    open_s: float,
    sides: Array,
    middle: Array,
) -> dict[str, Any]:
    """What a pass takes of its particles, by argument name.

    Parameters
    ----------
    info, index
        Clip and frame.
    held, fall
        The classes and how they move.
    reach_m
        The longest reach.
    open_s
        Time over which a particle is seen [s].
    sides, middle
        See `view_box`.

    Returns
    -------
    dict
        `particle_count`; and, their names beginning with `particle_` too: `at` (3, CLASSES) uint32, added to a hash it
        is the place in the box; `corner` (3,) int32 the lower corner of the box as seen from the eye; `axes` (9,)
        float32 from places in the box to the camera's frame [m a unit]; `move` (CLASSES, 8) float32: half of the way
        over `open_s` in the camera's frame, diameter [m], both in the scale of the longest reach, then `scale`;
        `bounds` (3,) float32: the longest half of a way and the largest diameter in that scale [m], the smallest
        `scale`; `steps` of depth a metre by which particles are put in order.
    """
    camera = info.camera(index)
    R, place = camera.camera_to_world[:3, :3], camera.camera_to_world[:3, 3] + np.asarray(info.world_origin)
    corner = np.rint((middle / sides - 0.5) * UNITS).astype(np.int64)
    box = sides * held.scale[:, None]
    moved = np.mod(fall.velocity * info.times[index], box) + fall.off - np.mod(place, box)
    at = np.floor(moved / box * UNITS).astype(np.int64) - corner
    relative = (fall.velocity + fall.rate - eye_velocity(info, index)) @ R
    move = np.zeros((CLASSES, 8))
    move[:, :3] = relative * (open_s / 2) / held.scale[:, None]
    move[:, 3] = held.diameter / held.scale
    move[:, 4] = held.scale
    bounds = np.array([np.linalg.norm(move[:, :3], axis=1).max(), move[:, 3].max(), held.scale.min()])
    return {
        "particle_count": held.count,
        "particle_at": (at % UNITS).T.astype(np.uint32),
        "particle_corner": corner.astype(np.int32),
        "particle_axes": (R.T * (sides / UNITS)).astype(np.float32).ravel(),
        "particle_move": move.astype(np.float32),
        "particle_bounds": bounds.astype(np.float32),
        "particle_steps": np.float32(KEYS / reach_m),
    }


@lru_cache(maxsize=4)  # the frames of a clip share them
def _rain_classes(p: RainStreaksParams, volume: float) -> Classes:
    assert p.drops is not None  # set by __post_init__
    if p.convention == "paper":
        return _uniform(PAPER_DROPS_MM, p.drops)
    return classes(rain_sizes(p.rate_mm_h), p.drops, p.reach_m, volume)


def rain_arguments(p: RainStreaksParams, info: ClipInfo, index: int) -> dict[str, Any]:
    """What the pass `rain_streaks` takes of its drops in a frame; a pure function of parameters, clip and number."""
    sides, middle = view_box(info, p.reach_m, index)
    paper = p.convention == "paper"
    if paper:
        sides[1] = max(sides[1], PAPER_HEIGHT_M)
    held = _rain_classes(p, float(sides.prod()))
    steady = np.asarray(p.wind_m_s) - held.speed[:, None] * (0.0, 1.0, 0.0) + _gusts(p.gust_m_s)
    none = np.zeros((CLASSES, 3))
    fall = Fall(velocity=steady, off=none, rate=none)
    open_s = PAPER_LENGTH / info.fps if paper else p.exposure_s
    out = particle_arguments(info, index, held, fall, p.reach_m, open_s, sides, middle)
    return out | {"particle_taper": 1 / PAPER_TAPER if paper else 1.0, "particle_lobe": DROP_LOBE}


@lru_cache(maxsize=4)
def _snow_classes(p: SnowFallParams, volume: float) -> Classes:
    assert p.flakes is not None  # set by __post_init__
    found = classes(snow_sizes(p.rate_mm_h), p.flakes, p.reach_m, volume)
    if p.convention == "physical":
        return found
    speed = np.full(CLASSES, PAPER_SNOW_SPEED)
    return Classes(count=p.flakes, diameter=found.diameter, scale=found.scale, speed=speed)


def snow_arguments(p: SnowFallParams, info: ClipInfo, index: int) -> dict[str, Any]:
    """What the pass `snow_fall` takes of its flakes in a frame; a pure function of parameters, clip and number."""
    assert p.flutter_m is not None  # set by __post_init__, as the next one
    assert p.gust_m_s is not None
    sides, middle = view_box(info, p.reach_m, index)
    held = _snow_classes(p, float(sides.prod()))
    steady = np.asarray(p.wind_m_s) - held.speed[:, None] * (0.0, 1.0, 0.0) + _gusts(p.gust_m_s)
    off, rate = _flutter(p.flutter_m, float(info.times[index]))
    fall = Fall(velocity=steady, off=off, rate=rate)
    out = particle_arguments(info, index, held, fall, p.reach_m, p.exposure_s, sides, middle)
    return out | {"particle_taper": 1.0, "particle_lobe": FLAKE_LOBE}
