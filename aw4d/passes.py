"""The passes: parameters, planes they read and write, layers they can give, and kernels, by the one name of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from aw4d.params import (
    AmbientParams,
    FogParams,
    HarmonizeParams,
    NightGradeParams,
    OvercastSkyParams,
    Params,
    SpotLightsParams,
)

TILE = 16  # [px] side of the squares for which lights are sorted out; a multiple of every vector width
GROUPS, GROUP_ITEMS = 64, 64  # enough to fill a GPU and to balance a CPU's cores


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One kernel of a pass, and what a work-item of it stands for.

    "pixels": a vector of pixels of one row, over (pitch / W, height). "tiles": a square of TILE pixels, over
    (ceil(width / TILE), ceil(height / TILE)). "one": a single work-item. "groups": work-groups of GROUP_ITEMS
    work-items that share the rows of the picture among them, GROUPS at most.
    """

    kernel: str
    over: Literal["pixels", "tiles", "one", "groups"] = "pixels"


@dataclass(frozen=True, kw_only=True)
class Pass:
    """What the pipeline and the backends must know of a pass.

    Parameters
    ----------
    params
        Class of its parameters.
    reads, writes
        Names of planes. One that is written and not among the clip's planes is listed in `WORKING`.
    optional
        Planes out of `reads` that are taken for 0 where a clip does not have them.
    layers
        Results that are kept only when they are asked for, with their number of channels.
    stages
        Its kernels in order; by default one of the pass' own name, over the pixels.
    scratch
        Device buffers that its stages share, by argument name: number of 32-bit values for (height [px], pitch [px],
        number of lights). Their contents are undefined when the first stage starts.
    """

    params: type[Params]
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    layers: dict[str, int]
    optional: tuple[str, ...] = ()
    stages: tuple[Stage, ...] = ()
    scratch: dict[str, Callable[[int, int, int], int]] = field(default_factory=dict)


# Planes that one pass writes for another and no clip holds, with their number of channels.
WORKING: dict[str, int] = {"direct": 3}


def _tile_words(height: int, pitch: int, lights: int) -> int:
    """A bit for every light in every tile."""
    return -(-height // TILE) * -(-pitch // TILE) * -(-lights // 32)


def _margin(height: int) -> int:
    """Room left and right of a row that `night_grade` reads across: more than its farthest reach and a vector."""
    return (height // 64 + 8) * 16


PASSES: dict[str, Pass] = {
    "ambient": Pass(
        params=AmbientParams,
        reads=("depth", "normal", "albedo", "roughness", "metallic", "sky"),
        writes=("rgb",),
        layers={"ambient": 3, "shadow": 1, "occlusion": 1},
        stages=(Stage(kernel="ambient_solid"), Stage(kernel="ambient_quads"), Stage(kernel="ambient")),
        scratch={
            "ambient_depth": lambda height, pitch, lights: height * pitch,
            "ambient_quad": lambda height, pitch, lights: 4 * (height + 1) * (pitch + 1),
        },
    ),
    "spot_lights": Pass(
        params=SpotLightsParams,
        reads=("depth", "normal", "albedo", "roughness", "metallic", "emissive", "sky"),
        writes=("direct",),
        optional=("emissive",),
        layers={"direct": 3},
        stages=(Stage(kernel="spot_lights_tiles", over="tiles"), Stage(kernel="spot_lights")),
        scratch={"tile_lights": _tile_words},
    ),
    "fog": Pass(
        params=FogParams,
        reads=("rgb", "depth", "sky"),
        writes=("rgb",),
        layers={"transmittance": 1, "in_scatter": 3, "airlight": 3},
    ),
    "harmonize": Pass(params=HarmonizeParams, reads=("rgb", "direct"), writes=("rgb",), layers={"fusion_weight": 1}),
    "overcast_sky": Pass(params=OvercastSkyParams, reads=("rgb", "sky"), writes=("rgb",), layers={}),
    "night_grade": Pass(
        params=NightGradeParams,
        reads=("rgb", "sky"),
        writes=("rgb",),
        layers={"sky_weight": 1},
        stages=(
            Stage(kernel="night_grade_prepare", over="one"),
            Stage(kernel="night_grade_count_high", over="groups"),
            Stage(kernel="night_grade_select_high", over="one"),
            Stage(kernel="night_grade_count_middle", over="groups"),
            Stage(kernel="night_grade_select_middle", over="one"),
            Stage(kernel="night_grade_count_low", over="groups"),
            Stage(kernel="night_grade_select_low", over="one"),
            Stage(kernel="night_grade_dilate_down"),
            Stage(kernel="night_grade_dilate_across"),
            Stage(kernel="night_grade_blur_down"),
            Stage(kernel="night_grade"),
        ),
        scratch={
            "grade_bins": lambda height, pitch, lights: 2048,
            "grade_state": lambda height, pitch, lights: 2,
            "grade_gain": lambda height, pitch, lights: 1,
            "grade_taps": lambda height, pitch, lights: _margin(height),
            "grade_grey": lambda height, pitch, lights: height * pitch,
            "grade_grown": lambda height, pitch, lights: height * pitch,
            "grade_seen": lambda height, pitch, lights: height * (pitch + 2 * _margin(height)),
            "grade_wide": lambda height, pitch, lights: height * (pitch + 2 * _margin(height)),
        },
    ),
}


def stages(name: str) -> tuple[Stage, ...]:
    """Kernels of a pass in order."""
    return PASSES[name].stages or (Stage(kernel=name),)
