"""The ego vehicle's headlights: a pair of spots fixed to the camera."""

from __future__ import annotations

import math

from aw4d.lights.light import Light
from aw4d.params import HeadlightParams


def headlights(p: HeadlightParams) -> list[Light]:
    """Two spots below and ahead of the camera, dipped; none where they are off.

    The intensity on the image's scale is candela over the luminance that shows as white. Paper, supplement
    "Light Source Implementation" (cones, reach).
    """
    if not p.on:
        return []
    red, green, blue = (p.candela / p.white_cd_m2 * c for c in p.color)
    dip = math.radians(p.pitch_deg)
    return [
        Light(
            kind="spot",
            position=(side * p.spacing_m / 2, p.below_m, p.ahead_m),
            direction=(0.0, math.sin(dip), math.cos(dip)),
            intensity=(red, green, blue),
            inner_deg=p.inner_deg,
            outer_deg=p.outer_deg,
            r_max_m=p.r_max_m,
            frame="camera",
        )
        for side in (-1, 1)
    ]
