"""Phase functions: how a droplet spreads the light that meets it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def henyey_greenstein(cos_theta: ArrayLike, *, g: float) -> NDArray[np.float64]:
    """Henyey-Greenstein phase function.

    Parameters
    ----------
    cos_theta
        Cosine of the scattering angle, any shape; 1 goes straight on: looking into the lamp.
    g
        Mean cosine, -1 < g < 1.

    Returns
    -------
    ndarray
        [1/sr], the shape of `cos_theta`. Integrates to 1 over the sphere; its mean cosine is g.

    Notes
    -----
    Henyey and Greenstein 1941; paper, supplement "Fog modeling".
    """
    mu = np.asarray(cos_theta, dtype=np.float64)
    return (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * mu) ** 1.5)
