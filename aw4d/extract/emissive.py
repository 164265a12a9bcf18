"""Surfaces that send light by themselves: lit traffic lights, and lit brake lights where nothing else can look so.

A picture clipped at white does not tell a lit red lens from one that the sun shines on, and what is wrongly taken for a
lamp glows at night. So both kinds need more than colour:

- a traffic light is a small, round, clipped and saturated blob above the camera, of a lens's size, in a dark housing;
- a brake light is a red blob in the lower half of a vehicle whose core is overexposed towards orange or white, under
  a sky that is not blue and in a picture that is not overexposed: under the sun no vehicle's lamps are taken for lit.

White lamps are left out: by day they cannot be told from white paint.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.colour import LUMINANCE
from aw4d.extract.pixels import check_sizes

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

CLIPPED = 0.85  # linear: a lit lens fills its channel even by day
SATURATED = 0.45  # of the strongest channel: the most that the weak ones have
FEWEST, MOST = 5, 4e-3  # [px] and share of the picture: areas of a blob
ROUND = (0.55, 1.8, 0.55)  # least and greatest width over height, least share of the bounding box
LENS_M = (0.06, 0.8)  # [m] diameters, with room for halo and wrong depth; real lenses have 0.2 and 0.3 m
HOUSING = 0.12  # linear luminance under which a lens's surroundings are a dark housing
ABOVE = 0.003  # slope of the lowest ray to a traffic light: its head is above the camera
CORE = 0.4  # green of a red lamp's core from which on it is overexposed
SUNNY = 0.9  # linear: where 2 % of the picture are whiter than this, sunlit lenses clip too
BLUE = 1.15  # blue over red of a sky without clouds
EDGE = 0.35  # of a blob's peak: what around it belongs to it


def _colours(rgb: Image) -> dict[str, Mask]:
    """Where the picture is clipped and of the colour of a signal."""
    red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    return {
        "red": (red > CLIPPED) & (green < SATURATED * red) & (blue < SATURATED * red),
        "amber": (red > CLIPPED) & (green > SATURATED * red) & (green < 0.85 * red) & (blue < 0.3 * red),
        # Signals are bluish green, and the sky is never more green than blue.
        "green": (green > CLIPPED) & (red < SATURATED * green) & (blue > 0.25 * green) & (blue < 0.97 * green),
    }


def _blobs(mask: Mask) -> Iterator[Mask]:
    """Compact round parts of a mask, each as a mask of the whole picture."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    width, height, area = stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT], stats[:, cv2.CC_STAT_AREA]
    aspect = width / height
    good = (area >= FEWEST) & (area <= MOST * mask.size) & (area >= ROUND[2] * width * height)
    good &= (aspect > ROUND[0]) & (aspect < ROUND[1])
    good[0] = False
    for number in np.flatnonzero(good):
        yield labels == number


def _spread(mask: Mask, by: float) -> Mask:
    size = 2 * max(1, round(by)) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0, dtype=np.bool_)


def _radius(blob: Mask) -> float:
    return float(np.sqrt(np.count_nonzero(blob) / np.pi))


def _in_housing(blob: Mask, luminance: Image) -> bool:
    """Whether a blob is set into something dark; the pixels on its edge do not count."""
    radius = _radius(blob)
    inner = 0.25 * radius + 1
    ring = _spread(blob, inner + 0.4 * radius + 0.5) & ~_spread(blob, inner)
    return bool(np.quantile(luminance[ring], 0.75) < HOUSING) if ring.any() else False


def _with_edge(blob: Mask, rgb: Image) -> Mask:
    """A blob and the pixels around it that it blurs into."""
    channel = int(rgb[blob].sum(axis=0).argmax())
    return np.asarray(_spread(blob, 0.25 * _radius(blob)) & (rgb[..., channel] > EDGE) & (rgb.argmax(-1) == channel))


def _traffic_lights(rgb: Image, luminance: Image, allowed: Mask, depth: Image, focal: float) -> Mask:
    lit = np.zeros(allowed.shape, np.bool_)
    for colour, mask in _colours(rgb).items():
        for blob in _blobs(mask & allowed):
            diameter = 2 * _radius(blob) * float(np.median(depth[blob])) / focal
            # Sunlit orange paint is no less clipped in red; only a lamp drives green up as well.
            hot = colour != "amber" or rgb[blob][:, 1].max() > 0.8
            if LENS_M[0] < diameter < LENS_M[1] and hot and _in_housing(blob, luminance):
                lit |= _with_edge(blob, rgb)
    return lit


def _lower_half(vehicle: NDArray[np.int32]) -> Mask:
    """Lower part of every vehicle, down from a quarter of its height: lamps, not what the windows show."""
    lower = np.zeros(vehicle.shape, np.bool_)
    for number in np.unique(vehicle[vehicle > 0]):
        body = vehicle == number
        rows = np.flatnonzero(body.any(axis=1))
        lower |= body & (np.arange(len(body))[:, None] > rows[0] + 0.25 * (rows[-1] - rows[0]))
    return lower


def _brake_lights(rgb: Image, vehicle: NDArray[np.int32]) -> Mask:
    red, green, blue = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    # The overexposed core is orange, so the hue is wider than a signal's.
    mask = (red > CLIPPED) & (green < 0.8 * red) & (blue < SATURATED * red) & _lower_half(vehicle)
    lit = np.zeros(mask.shape, np.bool_)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    for number in range(1, len(stats)):
        blob = labels == number
        body = np.count_nonzero(vehicle == vehicle[blob][0])
        hot = (rgb[blob][:, 0] > 0.97) & (rgb[blob][:, 1] > CORE)
        if np.count_nonzero(blob) >= FEWEST and np.count_nonzero(blob) < 0.05 * body and hot.mean() > 0.2:
            lit |= _with_edge(blob, rgb) & (vehicle > 0)
    return lit


def _is_sunny(rgb: Image, sky: Mask) -> bool:
    """Whether lenses may be sunlit: a blue sky, or none to tell by, or so bright a picture that anything clips."""
    white = float(np.quantile(rgb[~sky].min(axis=-1), 0.98)) if not sky.all() else 1.0
    if white < 0.1:
        return False  # night
    if np.count_nonzero(sky) < 1e-3 * sky.size:
        return True
    colour = rgb[sky].mean(axis=0)
    return white > SUNNY or bool(colour[2] > BLUE * colour[0])


def emissive(
    rgb_linear: Image,
    *,
    sky: Mask,
    road: Mask,
    vehicle: NDArray[np.int32],
    depth: NDArray[np.float32],
    camera: Camera,
) -> Image:
    """Radiance that surfaces send by themselves; the module's first lines say what is taken for a lamp.

    Parameters
    ----------
    rgb_linear
        Recorded image, (H, W, 3) scene-linear Rec. 709.
    sky, road
        (H, W) masks; neither sends light.
    vehicle
        (H, W) instance ids, 0 = none.
    depth
        (H, W) [m].
    camera
        The frame's camera; its world's y axis points up.

    Returns
    -------
    (H, W, 3) float32: the recorded radiance where a lamp is lit, 0 elsewhere. Where the record is clipped, the lamp is
    at least as bright.

    Raises
    ------
    InputError
        A plane is not of the camera's size.
    """
    check_sizes(camera, rgb_linear=rgb_linear, sky=sky, road=road, vehicle=vehicle, depth=depth)
    luminance = np.asarray(rgb_linear @ LUMINANCE, dtype=np.float32)
    up = camera.camera_to_world[1, :3]
    rays = camera.rays()
    above = rays @ up > ABOVE * np.linalg.norm(rays, axis=-1)
    lit = _traffic_lights(rgb_linear, luminance, above & ~sky & ~road & (vehicle == 0), depth, float(camera.K[1, 1]))
    if (vehicle > 0).any() and not _is_sunny(rgb_linear, sky):
        lit |= _brake_lights(rgb_linear, vehicle)
    return np.where((lit & ~sky & ~road)[..., None], rgb_linear, np.float32(0)).astype(np.float32)
