"""Colours of daylight from its spectrum, in linear Rec. 709."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]

WAVELENGTHS = np.arange(380.0, 781.0, 5.0)  # [nm]
XYZ_TO_RGB = np.array(  # IEC 61966-2-1, white D65
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
SUN_K = 5778.0  # temperature of the black body that the sun is taken for


def _lobe(middle: float, left: float, right: float) -> Array:
    sigma = np.where(middle > WAVELENGTHS, left, right)
    return np.exp(-0.5 * ((WAVELENGTHS - middle) / sigma) ** 2)


# CIE 1931 colour matching functions, multi-lobe fit of Wyman, Sloan and Shirley 2013.
_MATCHING = np.stack(
    [
        1.056 * _lobe(599.8, 37.9, 31.0) + 0.362 * _lobe(442.0, 16.0, 26.7) - 0.065 * _lobe(501.1, 20.4, 26.2),
        0.821 * _lobe(568.8, 46.9, 40.5) + 0.286 * _lobe(530.9, 16.3, 31.1),
        1.217 * _lobe(437.0, 11.8, 36.0) + 0.681 * _lobe(459.0, 26.0, 13.8),
    ]
)


def to_rgb(XYZ: ArrayLike) -> Array:
    """Linear Rec. 709 of tristimulus values (..., 3); what lies outside of the gamut is clipped, its luminance kept."""
    XYZ = np.asarray(XYZ, dtype=np.float64)
    rgb = np.maximum(XYZ @ XYZ_TO_RGB.T, 0.0)
    return rgb * (XYZ[..., 1] / np.maximum(rgb @ LUMINANCE, 1e-300))[..., None]


def from_xyY(x: ArrayLike, y: ArrayLike, Y: ArrayLike) -> Array:
    """Linear Rec. 709, (..., 3), of chromaticity and luminance."""
    x, y, Y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float), np.asarray(Y, float))
    return to_rgb(np.stack([Y * x / y, Y, Y * (1 - x - y) / y], axis=-1))


def black_body(kelvin: float) -> Array:
    """Spectral radiance of a black body at `WAVELENGTHS`, on any scale. Planck 1901."""
    return WAVELENGTHS**-5 / np.expm1(1.4388e7 / (WAVELENGTHS * kelvin))


def color_of(spectrum: Array) -> Array:
    """Linear Rec. 709 of luminance 1, (3,), of a spectrum at `WAVELENGTHS`."""
    rgb = to_rgb(_MATCHING @ spectrum)
    return rgb / (rgb @ LUMINANCE)


def color_of_temperature(kelvin: float) -> Array:
    """Linear Rec. 709 of luminance 1, (3,), of a black body."""
    return color_of(black_body(kelvin))


def air_mass(altitude_deg: float) -> float:
    """Air that sunlight crosses, over that at the zenith. Kasten 1965, as used by Preetham et al. 1999."""
    altitude = max(altitude_deg, 0.0)
    return 1 / (np.sin(np.radians(altitude)) + 0.15 * (altitude + 3.885) ** -1.253)


def sunlight(altitude_deg: float, turbidity: float) -> Array:
    """Spectrum of the sun behind the air, at `WAVELENGTHS`, 1 above it being a black body's.

    Rayleigh scattering and aerosols after Preetham, Shirley and Smits 1999, appendix 1; ozone and water are left out.
    """
    micron = WAVELENGTHS / 1000
    m = air_mass(altitude_deg)
    depth = 0.008735 * micron**-4.08 + max(0.04608 * turbidity - 0.04586, 0.0) * micron**-1.3
    return black_body(SUN_K) * np.exp(-depth * m)
