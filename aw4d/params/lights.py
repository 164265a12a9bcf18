"""Parameters of the lights: the ego vehicle's, the street's, other vehicles', and those given by hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from aw4d.errors import InputError
from aw4d.params.base import RGB, Params, param

BEAMS = ("low", "high")
_LOW_BEAM = {"candela": 20_000.0, "pitch_deg": 1.0, "r_max_m": 50.0}
_HIGH_BEAM = {"candela": 60_000.0, "pitch_deg": 0.0, "r_max_m": 120.0}


@dataclass(frozen=True, kw_only=True)
class HeadlightParams(Params):
    """The ego vehicle's own lamps, a pair fixed to the camera. Paper, supplement "Light Source Implementation".

    `beam` fills in `candela`, `pitch_deg` and `r_max_m` where they are not given: 20,000 cd dipped by 1 degree and 50 m
    low, 60,000 cd straight ahead and 120 m high.
    """

    on: bool = param(True, "", "whether they burn", "", host=True)
    beam: Literal["low", "high"] = param("low", "", "the beam: low or high", "UN R149", host=True)
    candela: float | None = param(
        None, "cd", "the luminous intensity of a lamp on its axis", "UN R149", low=0, high=1e6, host=True
    )
    color: RGB = param((1.0, 0.93, 0.82), "linear", "the colour of the lamps", "warm white", low=0, high=1, host=True)
    spacing_m: float = param(1.3, "m", "the distance between the lamps", "", low=0, high=3, host=True)
    below_m: float = param(0.9, "m", "how far they are below the camera", "", low=-1, high=4, host=True)
    ahead_m: float = param(1.6, "m", "how far they are ahead of the camera", "", low=-1, high=4, host=True)
    pitch_deg: float | None = param(None, "deg", "the dip of the beam", "UN R48: 1 to 2 %", low=-10, high=20, host=True)
    inner_deg: float = param(10.0, "deg", "the half angle of full brightness", "paper", low=0.1, high=89, host=True)
    outer_deg: float = param(25.0, "deg", "the half angle of darkness", "paper", low=0.2, high=89.9, host=True)
    r_max_m: float | None = param(None, "m", "the reach", "paper: 30 to 50 m", low=1, high=1e4, host=True)

    def __post_init__(self) -> None:
        if self.beam not in BEAMS:
            raise InputError(f"beam: expected {' or '.join(BEAMS)}, got {self.beam!r}")
        for name, value in (_HIGH_BEAM if self.beam == "high" else _LOW_BEAM).items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class LightParams(Params):
    """Which lights there are, and lights given by hand."""

    file: str = param("", "", "a JSON file of lights", "docs/lights.md", host=True)
    street: bool = param(True, "", "whether street lamps burn that the clip has masks of", "paper", host=True)
    poles: bool = param(True, "", "whether poles that the laser sees carry lamps where no mask is", "", host=True)
    vehicles: bool = param(True, "", "whether moving vehicles have head and tail lights", "paper", host=True)
    traffic: bool = param(True, "", "whether traffic lights and the like stay bright", "", host=True)
    off: str = param("", "", "the lights to switch off, by id, with commas", "docs/lights.md", host=True)


@dataclass(frozen=True, kw_only=True)
class StreetLampParams(Params):
    """Street lamps: spots that look down, one at the head of each lamp. Paper, "Light Source Implementation"."""

    candela: float = param(
        5_000.0, "cd", "the luminous intensity downwards", "70 W sodium, 50 W LED lanterns", low=0, high=1e6, host=True
    )
    color: RGB = param((1.0, 0.72, 0.42), "linear", "the colour", "3000 K LED", low=0, high=1, host=True)
    inner_deg: float = param(15.0, "deg", "the half angle of full brightness", "paper", low=0.1, high=89, host=True)
    outer_deg: float = param(35.0, "deg", "the half angle of darkness", "paper", low=0.2, high=89.9, host=True)
    r_max_m: float = param(20.0, "m", "the reach", "paper", low=1, high=1e4, host=True)
    face_cd_m2: float = param(
        20_000.0, "cd/m2", "the luminance of a lamp's face", "5,000 cd over 0.25 m2", low=0, high=1e7, host=True
    )
    face_radius_m: float = param(0.15, "m", "the radius of a lamp's face", "", low=0.01, high=1, host=True)
    every: int = param(3, "frame", "the step in which frames are searched for lamps", "", low=1, high=1000, host=True)
    pole_mount_m: float = param(6.0, "m", "the height of a pole's lamp above ground", "", low=2, high=20, host=True)
    pole_overhang_m: float = param(1.0, "m", "its distance from the pole, to the road", "", low=0, high=5, host=True)
    pole_spacing_m: float = param(
        10.0, "m", "the least distance of two poles that carry lamps", "", low=0, high=200, host=True
    )


@dataclass(frozen=True, kw_only=True)
class VehicleLightParams(Params):
    """Headlights and tail lights of the vehicles that move."""

    moving_m_s: float = param(
        1.0, "m/s", "the speed from which on a vehicle is no parked one", "", low=0, high=100, host=True
    )
    window_s: float = param(
        0.3, "s", "the time to either side that its speed is fitted over", "", low=0.01, high=10, host=True
    )
    head_candela: float = param(
        20_000.0,
        "cd",
        "the luminous intensity of a headlight on its axis",
        "UN R149 low beam",
        low=0,
        high=1e6,
        host=True,
    )
    head_color: RGB = param(
        (1.0, 0.93, 0.82), "linear", "the colour of headlights", "warm white", low=0, high=1, host=True
    )
    # A round cone has no cut-off. Narrow and dipped, it lights the road and leaves the eyes of who comes towards it in
    # the dark, as a low beam does; the paper's 10 and 25 degrees dipped by 1 would blind them (docs/lights.md).
    head_dip_deg: float = param(7.0, "deg", "the dip of their beam", "docs/lights.md", low=-10, high=20, host=True)
    head_inner_deg: float = param(
        4.0, "deg", "their half angle of full brightness", "docs/lights.md", low=0.1, high=89, host=True
    )
    head_outer_deg: float = param(
        10.0, "deg", "their half angle of darkness", "docs/lights.md", low=0.2, high=89.9, host=True
    )
    head_r_max_m: float = param(40.0, "m", "their reach", "paper: 30 to 50 m", low=1, high=1e4, host=True)
    head_cd_m2: float = param(
        20_000.0, "cd/m2", "the luminance of a headlight seen from beside its beam", "", low=0, high=1e7, host=True
    )
    tail_candela: float = param(
        20.0, "cd", "the luminous intensity of a tail light", "UN R148: 4 to 42 cd", low=0, high=1e4, host=True
    )
    # Light of 620 nm and more has no green at all in Rec. 709; the least of it would show as white once red is clipped.
    tail_color: RGB = param(
        (1.0, 0.0, 0.0), "linear", "the colour of tail lights", "UN R148: red", low=0, high=1, host=True
    )
    tail_inner_deg: float = param(30.0, "deg", "their half angle of full brightness", "", low=0.1, high=89, host=True)
    tail_outer_deg: float = param(80.0, "deg", "their half angle of darkness", "UN R148", low=0.2, high=89.9, host=True)
    tail_r_max_m: float = param(8.0, "m", "their reach", "", low=1, high=1e4, host=True)
    tail_cd_m2: float = param(3_000.0, "cd/m2", "the luminance of a tail light", "", low=0, high=1e7, host=True)
    head_height_m: float = param(
        0.65, "m", "the height of headlights above ground", "UN R48: 0.5 to 1.2 m", low=0, high=4, host=True
    )
    tail_height_m: float = param(
        0.7, "m", "the height of tail lights above ground", "UN R48: 0.35 to 1.5 m", low=0, high=4, host=True
    )
    aside: float = param(0.75, "1", "their place from the middle (0) to the side (1)", "", low=0, high=1, host=True)
    radius_m: float = param(0.09, "m", "the radius of a lamp's face", "", low=0.01, high=0.5, host=True)
