"""Fusion of the ambient light with that of the local lamps. Paper, supplement "Environment Harmonization".

Light adds up: the picture of a scene under two lights is the sum of its pictures under each. Two conventions, with A
the ambient radiance, D that of the lamps and m the mean of D's channels:

physical
    I = (1 - W) A + D with W = clip(strength max(m - threshold, 0), 0, 1): continuous, and A + D at strength 0.
paper
    I = (1 - W) A + W D with W = clip(strength m, 0, 1) where m >= threshold, else 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def harmonize(*, rgb: Array, direct: Array, strength: float, threshold: float, convention: str) -> dict[str, Array]:
    """Put ambient and local light together.

    Parameters
    ----------
    rgb
        (H, W, 3) scene-linear radiance under the ambient light, >= 0.
    direct
        (H, W, 3) radiance under the lamps alone, and what the surfaces send by themselves, >= 0.
    strength
        How much the lamps replace the ambient light, >= 0.
    threshold
        Mean radiance of the lamps below which they replace nothing.
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `rgb` (H, W, 3); `fusion_weight` (H, W), the W above.
    """
    mean = direct.sum(axis=-1) / 3
    if convention == "paper":
        weight = np.clip(strength * np.where(mean < threshold, 0.0, mean), 0.0, 1.0)
        lamps = weight[..., None] * direct
    else:
        weight = np.clip(strength * np.maximum(mean - threshold, 0.0), 0.0, 1.0)
        lamps = direct
    return {"rgb": (1 - weight)[..., None] * rgb + lamps, "fusion_weight": weight}
