"""The sky under clouds: less colour, and a tint. Paper, supplement "Atmospheric Effects".

A sky pixel C of luminance Y (Rec. 709) first loses a share of its colour, C' = C + desaturation (Y - C), and is then
blended with the tint T, (1 - amount) C' + amount T'. Two conventions:

physical
    T' = Y T / Y(T): the tint has the pixel's own luminance, which the pass thus keeps; only the colour changes.
paper
    T' = T.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]


def overcast_sky(
    *,
    rgb: Array,
    sky: NDArray[np.bool_],
    tint: tuple[float, float, float],
    amount: float,
    desaturation: float,
    convention: str,
) -> dict[str, Array]:
    """Cover the sky with clouds.

    Parameters
    ----------
    rgb
        (H, W, 3) scene-linear radiance, >= 0.
    sky
        (H, W) True where the sky is seen; nothing else changes.
    tint
        The clouds' colour, linear, not all 0.
    amount
        Share of the tint, 0 to 1.
    desaturation
        Share of its colour that the sky loses first, 0 to 1.
    convention
        "physical" or "paper".

    Returns
    -------
    dict
        `rgb` (H, W, 3).
    """
    color = np.asarray(tint, dtype=np.float64)
    luminance = (rgb @ LUMINANCE)[..., None]
    grey = (1 - desaturation) * rgb + desaturation * luminance
    clouds = color if convention == "paper" else luminance * color / (color @ LUMINANCE)
    return {"rgb": np.where(sky[..., None], (1 - amount) * grey + amount * clouds, rgb)}
