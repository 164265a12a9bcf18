"""The picture as it is shown and stored: 8-bit sRGB. What every edit ends with; it has no parameters and no layers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.srgb import linear_to_srgb


def srgb8(*, rgb: NDArray[np.float64]) -> dict[str, NDArray[np.uint8]]:
    """Codes of a picture.

    Parameters
    ----------
    rgb
        Scene-linear (H, W, 3); 1 is display white, more is clipped.

    Returns
    -------
    `image`, (H, W, 3) sRGB (IEC 61966-2-1), rounded to the nearest of 256 codes.
    """
    return {"image": np.rint(255 * linear_to_srgb(rgb)).astype(np.uint8)}
