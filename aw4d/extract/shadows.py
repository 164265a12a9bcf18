"""Where the sun does not shine: lit and shadowed asphalt, and from them the shadow on everything else.

A shadow outdoors is darker and bluer than the light around it, since the sky alone lights it (Finlayson et al. 2006).
Asphalt shows by how much: its brightness falls into two groups. What else is in the picture is a mixture of
materials, each of which occurs lit, or darker and bluer by just that step; the mixture is fitted to the frame
(expectation maximisation, Dempster et al. 1977), and each pixel asked which of the two it is. A pure function of
the frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.colour import LUMINANCE

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Array = NDArray[np.float64]

FLOOR = 2e-3  # radiance under which an 8-bit recording tells nothing (6 codes of sRGB)
BLUE = -0.15  # log red / blue of asphalt under which the sky alone lights it
LEAST_STEP = 0.6  # log ratio of lit to shadowed that a cast shadow has
MATERIALS = 16
SAMPLES = 3000  # pixels that the mixture is fitted to
ROUNDS = 15
SPREAD = np.array([0.5, 0.12, 0.12])  # of a street's reflectances within a material: brightness, warmth, greenness
NARROWEST = np.array([0.25, 0.08, 0.08])
USUAL = np.array([0.6, 0.4])  # shares of lit and shadowed
PRIOR_SPREAD = 0.8  # of the materials' brightness about that of asphalt
MATTE_RADIUS = 8  # [px] within which the border of a shadow follows the picture
MATTE_EDGE = 0.05  # variance of log brightness above which it does so
DARKEST, DARK = np.log(2e-3), np.log(8e-3)  # log brightness between which noise forbids, and allows, lifting a shadow


@dataclass(frozen=True, kw_only=True, eq=False)
class Sunlight:
    """Asphalt in the sun and in the shadow.

    Parameters
    ----------
    lit, shadowed
        (3,) log brightness, warmth and greenness (`tones`).
    certainty
        0 (no cast shadow is seen) to 1.
    """

    lit: Array
    shadowed: Array
    certainty: float

    @property
    def step(self) -> Image:
        """Log ratio of lit to shadowed, (3,) for red, green and blue; zero where no shadow is seen."""
        return np.asarray(self.certainty * np.log(from_tones(self.lit) / from_tones(self.shadowed)), dtype=np.float32)


def masked_blur(image: Image, mask: Mask, sigma: float) -> Image:
    """Gaussian mean over what is in the mask, so that nothing bleeds in from outside; (H, W) or (H, W, C)."""
    weight = mask.astype(np.float32)
    total = cv2.GaussianBlur(image * (weight if image.ndim == 2 else weight[..., None]), (0, 0), sigma)
    weight = np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-6)
    return np.asarray(total / (weight if image.ndim == 2 else weight[..., None]), dtype=np.float32)


def tones(rgb: Image) -> Image:
    """Log brightness, warmth (log red / blue) and greenness (log green over the mean of both), (..., 3)."""
    red, green, blue = np.moveaxis(np.log(np.maximum(rgb, FLOOR)), -1, 0)
    brightness = np.log(np.maximum(rgb @ LUMINANCE, FLOOR))
    return np.stack([brightness, red - blue, green - (red + blue) / 2], axis=-1).astype(np.float32)


def from_tones(tone: NDArray[np.floating]) -> Image:
    """Linear colour of tones, (..., 3): the inverse of `tones`."""
    half, green = tone[..., 1] / 2, tone[..., 2]
    colour = np.exp(np.stack([half, green, -half], axis=-1))
    return np.asarray(colour * (np.exp(tone[..., 0]) / (colour @ LUMINANCE))[..., None], dtype=np.float32)


def _ramp(value: float, low: float, high: float) -> float:
    return float(np.clip((value - low) / (high - low), 0, 1))


def sunlight(rgb: Image, asphalt: Mask) -> Sunlight | None:
    """Find sun and shadow on the asphalt; None where there is too little of it.

    Shadowed is what is blue, and darker than the rest: neither a dark car's mirror image nor a change from asphalt to
    concrete is both, in a picture whose white is set by the sun. The certainty falls to 0 where the two differ too
    little, where one of them is a few pixels, or where even the lit part is dark (night).
    """
    if np.count_nonzero(asphalt) < max(64, 2e-3 * asphalt.size):
        return None
    values = tones(masked_blur(rgb, asphalt, 1.2)[asphalt])
    middle = np.median(values, axis=0).astype(np.float64)
    blue = values[:, 1] < BLUE
    if blue.all() or not blue.any():
        return Sunlight(lit=middle, shadowed=middle, certainty=0.0)
    dark = blue & (values[:, 0] < np.median(values[~blue, 0]) - LEAST_STEP)
    if not dark.any():
        return Sunlight(lit=middle, shadowed=middle, certainty=0.0)
    shadowed = np.median(values[dark], axis=0).astype(np.float64)
    # What is nearer to the shadow lies in the penumbra.
    bright = ~blue & (values[:, 0] > (shadowed[0] + np.median(values[~blue, 0])) / 2)
    lit = np.median(values[bright], axis=0).astype(np.float64)
    certainty = (
        _ramp(lit[0] - shadowed[0], LEAST_STEP, 1.0)
        * _ramp(lit[1] - shadowed[1], 0.1, 0.25)
        * _ramp(min(float(dark.mean()), float(bright.mean())), 0.003, 0.015)
        * _ramp(lit[0], np.log(0.03), np.log(0.08))
    )
    return Sunlight(lit=lit if certainty > 0 else middle, shadowed=shadowed, certainty=certainty)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Mixture:
    """Materials that occur lit at `mean` and shadowed one step below; share (K, 2), mean and variance (K, 3)."""

    mean: Array
    variance: Array
    share: Array
    step: Array

    def belonging(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Probability of each material, lit or shadowed, (N, 3) to (N, K, 2)."""
        logs = np.empty((len(values), *self.share.shape), values.dtype)
        for k, (mean, variance) in enumerate(zip(self.mean, self.variance, strict=True)):
            scale = (1 / np.sqrt(2 * variance)).astype(values.dtype)
            away = (values - mean.astype(values.dtype)) * scale
            shadowed = away + (self.step.astype(values.dtype) * scale)
            level = np.log(self.share[k]) - np.log(variance).sum() / 2
            logs[:, k, 0] = level[0] - np.einsum("nc,nc->n", away, away)
            logs[:, k, 1] = level[1] - np.einsum("nc,nc->n", shadowed, shadowed)
        logs -= logs.max(axis=(1, 2), keepdims=True)
        np.exp(logs, out=logs)
        logs /= logs.sum(axis=(1, 2), keepdims=True)
        return logs


def _kinds(values: Array, step: Array, asphalt: Array) -> NDArray[np.int64]:
    """Materials by what a shadow does not change: k-means from far-apart seeds, the first of them asphalt, (N,)."""
    along = step / SPREAD
    along /= np.linalg.norm(along)
    invariant = (values - asphalt) / SPREAD
    invariant -= (invariant @ along)[:, None] * along
    seeds = [np.zeros(3)]
    away = (invariant**2).sum(axis=1)
    for _ in range(MATERIALS - 1):
        # The very farthest pixels are odd ones.
        seeds.append(invariant[np.argsort(away, kind="stable")[int(0.97 * len(away))]])
        away = np.minimum(away, ((invariant - seeds[-1]) ** 2).sum(axis=1))
    centre = np.array(seeds)
    for _ in range(10):
        kind = ((invariant[:, None] - centre) ** 2).sum(axis=-1).argmin(axis=1)
        for k in np.unique(kind):
            centre[k] = invariant[kind == k].mean(axis=0)
    return np.asarray(kind, dtype=np.int64)


def _first_guess(values: Array, step: Array, asphalt: Array) -> _Mixture:
    """Take the brightest part of each material for lit, unless that is far too dark to be."""
    kind = _kinds(values, step, asphalt)
    mean = np.tile(asphalt, (MATERIALS, 1))
    for k in np.unique(kind):
        own = values[kind == k]
        bright = own[:, 0] >= np.percentile(own[:, 0], 85) - step[0] / 2
        mean[k] = np.median(own[bright], axis=0)
        if mean[k, 0] < asphalt[0] - 0.75 * step[0]:
            mean[k] += step
    variance = np.tile((SPREAD**2), (MATERIALS, 1))
    return _Mixture(mean=mean, variance=variance, share=np.full((MATERIALS, 2), 0.5 / MATERIALS), step=step)


def _fit(values: Array, step: Array, asphalt: Array) -> _Mixture:
    """Fit the mixture to (N, 3) tones."""
    mixture = _first_guess(values, step, asphalt)
    weak = 0.005 * len(values)  # pixels that the priors are worth
    for _ in range(ROUNDS):
        lit, shadowed = np.moveaxis(mixture.belonging(values), -1, 0)
        count = (lit + shadowed).sum(axis=0)[:, None]
        pull = weak * mixture.variance / PRIOR_SPREAD**2 * [1, 0, 0]
        total = lit.T @ values + shadowed.T @ (values + step)
        mean = (total + pull * asphalt) / np.maximum(count + pull, 1e-9)
        square = lit.T @ values**2 + shadowed.T @ (values + step) ** 2
        scatter = square - 2 * mean * total + mean**2 * count
        variance = np.maximum((scatter + weak * 2 * NARROWEST**2) / (count + weak), NARROWEST**2)
        # Every material is held to occur both ways, or luck would decide how a dark one is seen.
        share = np.stack([lit.sum(axis=0), shadowed.sum(axis=0)], axis=-1) + 2 + 2 * count * USUAL
        mixture = _Mixture(mean=mean, variance=variance, share=share / share.sum(), step=step)
    return mixture


def _follow(matte: Image, guide: Image, mask: Mask) -> Image:
    """Let the borders of a matte follow the picture: guided filter (He, Sun and Tang 2013) within the mask."""
    size = (2 * MATTE_RADIUS + 1,) * 2
    inside = mask.astype(np.float32)
    weight = np.maximum(cv2.blur(inside, size), 1e-6)

    def mean(values: Image) -> Image:
        return np.asarray(cv2.blur(values * inside, size) / weight, dtype=np.float32)

    centre, level = mean(guide), mean(matte)
    slope = (mean(guide * matte) - centre * level) / (mean(guide * guide) - centre**2 + MATTE_EDGE)
    return np.clip(mean(slope) * guide + mean(level - slope * centre), 0, 1)


def shadow_matte(rgb: Image, mask: Mask, sun: Sunlight) -> Image:
    """How deep in the shadow each pixel of the mask lies, in units of the step in log colour, (H, W), 0 to 1.

    Parameters
    ----------
    rgb
        Recorded picture, (H, W, 3) scene-linear.
    mask
        (H, W), what to judge; 0 comes out elsewhere.
    sun
        From `sunlight`, its certainty above 0.
    """
    smooth = masked_blur(rgb, mask, 1.5)
    coarse = mask[::2, ::2]
    values = tones(smooth[::2, ::2][coarse])
    if len(values) < MATERIALS:
        return np.zeros(mask.shape, dtype=np.float32)
    sample = values[:: max(len(values) // SAMPLES, 1)].astype(np.float64)
    mixture = _fit(sample, sun.lit - sun.shadowed, sun.lit)
    found = np.zeros(coarse.shape, dtype=np.float32)
    found[coarse] = mixture.belonging(values)[..., 1].sum(axis=1)
    found = masked_blur(found, coarse, 0.7)
    matte = cv2.resize(found, mask.shape[::-1], interpolation=cv2.INTER_LINEAR)
    brightness = np.log(np.maximum(smooth @ LUMINANCE, 1e-4))
    matte = _follow(np.asarray(matte, dtype=np.float32), brightness.astype(np.float32), mask)
    heard = np.clip((brightness - DARKEST) / (DARK - DARKEST), 0, 1)
    return np.where(mask, matte * heard, 0).astype(np.float32)
