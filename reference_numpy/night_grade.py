"""Tone and colour of the night. Paper, supplement "LUT Construction for Global Tone Mapping".

In order, all in linear light and without a table:

1. exposure: C = gain rgb with gain = (0.98 - 0.20 s) clip(0.22 / (L_p + eps), 0.6, 1.6), where s is the strength and
   L_p the frame's percentile of luminance, an order statistic (nearest rank), or a luminance that is given;
2. highlights: C / (1 + 0.25 C), which tends to 4;
3. the table's factors on the sRGB code: decode(min(f encode(C), 1)) with f = beta (0.85 - 0.15 s, 0.9 - 0.1 s,
   1.05 + 0.2 s) and beta = 0.7 + 0.2 (1 - s). Under "paper" the code is cut off at 1 before, as a table of 256 entries
   does; else sRGB's curve goes on, and a lamp stays brighter than white paper;
4. sky: times 1 - (1 - sky_factor) w, where w is the mask, dilated by a square and blurred by a Gaussian.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.srgb import LUMINANCE, decode, encode

Array = NDArray[np.float64]

EPSILON = 1e-6  # luminance; without effect but at 0 / 0: the ratio is clipped long before
ROWS = 704  # height of the pictures for which the paper gives its pixels


def night_grade(
    *,
    rgb: Array,
    sky: NDArray[np.bool_],
    strength: float,
    percentile: int,
    luminance: float,
    sky_factor: float,
    sky_dilate_px: int,
    sky_blur_px: int,
    convention: str,
) -> dict[str, Array]:
    """Give a frame the tone and the colour of the night.

    Parameters
    ----------
    rgb
        (H, W, 3) scene-linear radiance, >= 0.
    sky
        (H, W) True where the sky is seen.
    strength
        Strength of the night s, 0 to 1; 0 is a mild grade, not none.
    percentile
        Share of pixels up to the luminance that sets the exposure [%].
    luminance
        The luminance that sets the exposure; below 0: the frame's own.
    sky_factor
        What is left of the sky's light.
    sky_dilate_px, sky_blur_px
        Reach of the dilation and standard deviation of the blur, px of a picture of `ROWS` rows ("paper": px).
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `rgb` (H, W, 3), 0 to 1; `sky_weight` (H, W), the w above.
    """
    paper = convention == "paper"
    if luminance < 0:
        luminance = nearest_rank(rgb @ LUMINANCE, percentile)
    lit = rgb * gain(luminance, strength)
    code = encode(lit / (1 + 0.25 * lit))
    if paper:
        code = np.minimum(code, 1.0)
    graded = decode(np.minimum(code * factors(strength), 1.0))
    rows = ROWS if paper else len(sky)
    grown = _grown(sky, sky_dilate_px, rows)
    weight, beside = (_smoothed(mask, sky_blur_px, rows) for mask in (grown, ~grown))
    kept = sky_factor + (1 - sky_factor) * beside  # 1 - (1 - sky_factor) w, which cancels where w is 1
    return {"rgb": graded * kept[..., None], "sky_weight": weight}


def nearest_rank(values: Array, percentile: int) -> float:
    """The smallest value that at least `percentile` % of all do not exceed: one of them, no interpolation."""
    rank = -(-values.size * percentile // 100)
    return float(np.partition(values, rank - 1, axis=None)[rank - 1])


def gain(luminance: float, strength: float) -> float:
    """Exposure for a scene whose percentile is that luminance."""
    return (0.98 - 0.20 * strength) * min(max(0.22 / (luminance + EPSILON), 0.6), 1.6)


def factors(strength: float) -> Array:
    """What the printed table multiplies the sRGB code of each channel by."""
    beta = 0.7 + 0.2 * (1 - strength)
    return beta * np.array([0.85 - 0.15 * strength, 0.9 - 0.1 * strength, 1.05 + 0.2 * strength])


def sky_weight(sky: NDArray[np.bool_], *, dilate_px: int, blur_px: int, rows: int) -> Array:
    """The mask dilated by a square and blurred, 0 to 1, (H, W); pixels are those of a picture of `ROWS` for `rows`.

    The dilation reaches whole pixels, the blur to 3 standard deviations. Beyond its border the picture goes on.
    """
    return _smoothed(_grown(sky, dilate_px, rows), blur_px, rows)


def _grown(mask: NDArray[np.bool_], dilate_px: int, rows: int) -> NDArray[np.bool_]:
    reach = (2 * dilate_px * rows + ROWS) // (2 * ROWS)  # nearest, and in integers: the same everywhere
    return _dilated(_dilated(mask, reach).T, reach).T


def _smoothed(mask: NDArray[np.bool_], blur_px: int, rows: int) -> Array:
    reach = -(-3 * blur_px * rows // ROWS)
    sigma = max(blur_px, 1) * rows / ROWS  # without a blur there is one tap, whatever its width
    taps = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    taps /= taps.sum()
    return _blurred(_blurred(mask.astype(np.float64), taps).T, taps).T


def _dilated(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Whether there is a True up to `reach` rows above or below."""
    count = np.pad(np.cumsum(mask, axis=0), ((1, 0), (0, 0)))
    row = np.arange(len(mask))
    first, last = np.maximum(row - reach, 0), np.minimum(row + reach + 1, len(mask))
    return count[last] > count[first]


def _blurred(values: Array, taps: Array) -> Array:
    """Weighted sum over the rows above and below, the first and the last row repeated."""
    padded = np.pad(values, ((len(taps) // 2,) * 2, (0, 0)), mode="edge")
    return sum((tap * padded[k : k + len(values)] for k, tap in enumerate(taps)), start=np.zeros_like(values))
