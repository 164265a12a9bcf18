"""The phase function: a distribution over the sphere whose mean cosine is its parameter."""

from __future__ import annotations

import numpy as np
import pytest

from reference_numpy.phase import henyey_greenstein
from reference_numpy.sampling import gauss_legendre

ASYMMETRIES = [-0.999, -0.8, -0.3, 0.0, 0.3, 0.8, 0.999]


def _over_the_sphere(g: float, power: int) -> float:
    """Integral of p(mu) mu^power over all directions.

    The peak of g = 0.999 is 1e-6 wide: q^2 = 1 + g^2 - 2 g mu, with log q as the variable, spreads it out.
    """
    x, w = gauss_legendre(200)
    if g == 0:
        mu, step = x, w
    else:
        low, high = np.log1p(-abs(g)), np.log1p(abs(g))
        q2 = np.exp(2 * (low + (high - low) * (x + 1) / 2))
        mu, step = (1 + g * g - q2) / (2 * g), w * (high - low) / 2 * q2 / abs(g)
    return float(2 * np.pi * np.sum(step * henyey_greenstein(mu, g=g) * mu**power))


@pytest.mark.parametrize("g", ASYMMETRIES)
def test_integrates_to_one(g: float) -> None:
    assert _over_the_sphere(g, power=0) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("g", ASYMMETRIES)
def test_mean_cosine_is_g(g: float) -> None:
    assert _over_the_sphere(g, power=1) == pytest.approx(g, abs=1e-9)


def test_forward_scattering_points_into_the_lamp() -> None:
    assert henyey_greenstein(1.0, g=0.8) > 100 * henyey_greenstein(-1.0, g=0.8)
