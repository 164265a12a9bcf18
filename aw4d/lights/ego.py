"""The ego vehicle's headlights: a pair of spots fixed to the camera."""

from __future__ import annotations

import math

from aw4d.lights.light import Light
from aw4d.lights.photometry import on_picture
from aw4d.params import HeadlightParams


def headlights(p: HeadlightParams, *, white_cd_m2: float) -> list[Light]:
    """Two spots below and ahead of the camera, low or high beam; none where they are off.

    Paper, supplement "Light Source Implementation" (cones, reach).

    Parameters
    ----------
    p
        Their place, beam and strength.
    white_cd_m2
        The luminance that the picture shows as white.
    """
    if not p.on:
        return []
    assert p.candela is not None  # set by the beam, as are these:
    assert p.pitch_deg is not None
    assert p.r_max_m is not None
    intensity = on_picture(p.candela, p.color, white_cd_m2)
    dip = math.radians(p.pitch_deg)
    return [
        Light(
            kind="spot",
            position=(side * p.spacing_m / 2, p.below_m, p.ahead_m),
            direction=(0.0, math.sin(dip), math.cos(dip)),
            intensity=intensity,
            inner_deg=p.inner_deg,
            outer_deg=p.outer_deg,
            r_max_m=p.r_max_m,
            frame="camera",
            name=f"ego-{name}",
        )
        for side, name in ((-1, "left"), (1, "right"))
    ]
