"""Luminous intensities and luminances of coloured lights on the picture's scale."""

from __future__ import annotations

from aw4d.params import RGB
from reference_numpy.srgb import LUMINANCE


def on_picture(amount: float, color: RGB, white_cd_m2: float) -> RGB:
    """Radiant intensity of so many candela, or radiance of so many cd/m2, linear RGB on the picture's scale.

    The luminance of the result is the amount over the luminance that shows as white; a black colour gives none.
    """
    luminance = float(LUMINANCE @ color)
    scale = amount / white_cd_m2 / luminance if luminance > 0 else 0.0
    red, green, blue = color
    return red * scale, green * scale, blue * scale
