"""The passes: parameters, planes they read and write, layers they can give, and kernels, by the one name of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from aw4d.gbuffer import PLANES
from aw4d.params import (
    AmbientParams,
    FogParams,
    HarmonizeParams,
    NightGradeParams,
    OvercastSkyParams,
    Params,
    PuddlesParams,
    RainStreaksParams,
    ReflectionsParams,
    RipplesParams,
    SnowCoverParams,
    SnowFallParams,
    SpotLightsParams,
    WetGroundParams,
)
from reference_numpy.row_means import BLOCKS

TILE = 16  # [px] side of the squares for which lights are sorted out; a multiple of every vector width
BAND = 64  # [px] rows of a tile of particles on a CPU: what one holds fits its first cache. Elsewhere TILE
CHUNKS = 64  # of particles that are counted together
DIGITS = 256  # of a digit by which they are sorted
RECORD = 32  # values a particle that is drawn: of two cache lines
BUNDLE = 512  # particles whose bits are written together
SHARES = 256  # of the particles, a work-item each, on a CPU: enough to balance its cores
PACK = 64  # vectors of particles that a work-item looks through
GROUPS, GROUP_ITEMS = 64, 64  # enough to fill a GPU and to balance a CPU's cores


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One kernel of a pass, and what a work-item of it stands for.

    "pixels": a vector of pixels of one row, over (pitch / W, height). "tiles": a vector of squares of TILE pixels,
    over (ceil(width / TILE / W), ceil(height / TILE)). "one": a single work-item. "groups": work-groups of GROUP_ITEMS
    work-items that share the rows of the picture among them, GROUPS at most. "particles": a share of them, SHARES in
    all on a CPU, else a vector or less, in groups of GROUP_ITEMS. "packs": PACK vectors of them. "chunks": a share of
    them, CHUNKS in all. "strips": a vector of pixels in each of TILE rows, over (pitch / W, ceil(height / TILE)).
    "bands": the same of BAND rows on a CPU.
    """

    kernel: str
    over: Literal["pixels", "tiles", "one", "groups", "particles", "packs", "chunks", "strips", "bands"] = "pixels"


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
        Planes out of `reads` that are taken for 0, or as `EMPTY` says, where neither clip nor an earlier pass has them.
    layers
        Results that are kept only when they are asked for, with their number of channels.
    stages
        Its kernels in order; by default one of the pass' own name, over the pixels.
    counts
        The argument that is the number of what it has, lights or particles.
    scratch
        Device buffers that its stages share, by argument name: number of 32-bit values for (height [px], pitch [px],
        the number of what `counts` says). Their contents are undefined when the first stage starts.
    """

    params: type[Params]
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    layers: dict[str, int]
    optional: tuple[str, ...] = ()
    stages: tuple[Stage, ...] = ()
    counts: str = "light_count"
    scratch: dict[str, Callable[[int, int, int], int]] = field(default_factory=dict)


# Planes that one pass writes for another and no clip holds, with their number of channels.
WORKING: dict[str, int] = {"direct": 3, "occlusion": 1, "puddle": 1, "snow_bare": 1, "snow_coverage": 1, "wetness": 1}
# The picture as it is shown, 8-bit sRGB, and what makes it of "rgb" once all passes are done.
IMAGE, SHOW = "image", "srgb8"
# What a plane is taken for that nobody made, other than 0: the share of a surface that snow leaves bare.
EMPTY: dict[str, float] = {"snow_bare": 1.0}


def held_as(plane: str) -> tuple[int, type]:
    """Channels and dtype of a plane, a layer or the image."""
    if plane == IMAGE:
        return 3, np.uint8
    if plane in PLANES:
        return PLANES[plane].channels, PLANES[plane].dtype
    layers = {layer: channels for entry in PASSES.values() for layer, channels in entry.layers.items()}
    return (WORKING | layers)[plane], np.float32


def _tile_words(height: int, pitch: int, lights: int) -> int:
    """A bit for every light in every tile."""
    return -(-height // TILE) * -(-pitch // TILE) * -(-lights // 32)


def _margin(height: int) -> int:
    """Room left and right of a row that `night_grade` reads across: more than its farthest reach and a vector."""
    return (height // 64 + 8) * 16


def _particle_bits(height: int, pitch: int, particles: int) -> int:
    """A bit for every particle in every column and every row of tiles, in words of 64."""
    return 2 * (-(-height // TILE) + -(-pitch // TILE)) * (BUNDLE // 64) * -(-particles // BUNDLE)


def _falling(name: str, params: type[Params], layer: str) -> Pass:
    """A pass that draws particles; its stages but for the last are those of particles.h."""
    return Pass(
        params=params,
        reads=("rgb", "depth", "sky"),
        writes=("rgb",),
        layers={f"{layer}_alpha": 1, f"{layer}_depth": 1},
        stages=(
            Stage(kernel="particle_keys", over="packs"),
            Stage(kernel="particle_count_low", over="chunks"),
            Stage(kernel="particle_sum_low", over="one"),
            Stage(kernel="particle_spread_low", over="chunks"),
            Stage(kernel="particle_count_high", over="chunks"),
            Stage(kernel="particle_sum_high", over="one"),
            Stage(kernel="particle_spread_high", over="chunks"),
            Stage(kernel="particle_records", over="particles"),
            Stage(kernel="particle_bins", over="particles"),
            Stage(kernel=name, over="bands"),
        ),
        counts="particle_count",
        scratch={
            "particle_key": lambda height, pitch, count: count,
            "particle_pack": lambda height, pitch, count: count + TILE,  # and a vector
            "particle_packed": lambda height, pitch, count: -(-count // PACK),
            "particle_by_low": lambda height, pitch, count: count,
            "particle_order": lambda height, pitch, count: count,
            "particle_counts": lambda height, pitch, count: DIGITS * CHUNKS,
            "particle_shown": lambda height, pitch, count: 1,
            "particle_record": lambda height, pitch, count: RECORD * (count + TILE),
            "particle_box": lambda height, pitch, count: 4 * (count + TILE),
            "particle_bits": _particle_bits,
        },
    )


PASSES: dict[str, Pass] = {
    "wet_ground": Pass(
        params=WetGroundParams,
        reads=("albedo", "roughness", "metallic", "normal", "sky", "road", "snow_bare"),
        writes=("albedo", "roughness", "wetness"),
        optional=("road", "snow_bare"),
        layers={"wetness": 1},
    ),
    "puddles": Pass(
        params=PuddlesParams,
        reads=("depth", "normal", "albedo", "roughness", "sky", "road", "snow_bare"),
        writes=("albedo", "normal", "roughness", "puddle"),
        optional=("snow_bare",),
        layers={"puddle": 1},
    ),
    "ripples": Pass(
        params=RipplesParams,
        reads=("puddle", "normal", "roughness", "depth"),
        writes=("normal", "roughness"),
        optional=("puddle",),
        layers={"ripple": 1},
    ),
    "ambient": Pass(
        params=AmbientParams,
        reads=("depth", "normal", "albedo", "roughness", "metallic", "sky"),
        writes=("rgb", "occlusion"),
        layers={"ambient": 3, "shadow": 1, "occlusion": 1},
        stages=(Stage(kernel="ambient_solid"), Stage(kernel="ambient_quads"), Stage(kernel="ambient")),
        scratch={
            "ambient_depth": lambda height, pitch, lights: height * (pitch + 2 * TILE),
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
    "snow_cover": Pass(
        params=SnowCoverParams,
        reads=("depth", "normal", "albedo", "roughness", "metallic", "sky", "road", "vehicle"),
        writes=("depth", "normal", "albedo", "roughness", "metallic", "snow_coverage", "snow_bare"),
        optional=("road", "vehicle"),
        layers={"snow_coverage": 1, "snow_height": 1},
    ),
    "reflections": Pass(
        params=ReflectionsParams,
        reads=(
            *("rgb", "depth", "normal", "albedo", "roughness", "metallic", "sky"),
            *("emissive", "puddle", "wetness", "occlusion"),
        ),
        writes=("rgb",),
        optional=("emissive", "puddle", "wetness", "occlusion"),
        layers={"reflection": 3},
        stages=(Stage(kernel="reflections_pixels", over="strips"), Stage(kernel="reflections")),
        scratch={
            "reflection_pixels": lambda height, pitch, lights: 4 * height * (pitch + TILE),
            "reflection_means": lambda height, pitch, lights: 4 * (pitch + TILE) * sum(-(-height // n) for n in BLOCKS),
        },
    ),
    "fog": Pass(
        params=FogParams,
        reads=("rgb", "depth", "sky"),
        writes=("rgb",),
        layers={"transmittance": 1, "in_scatter": 3, "airlight": 3},
        stages=(Stage(kernel="fog_tiles", over="tiles"), Stage(kernel="fog")),
        scratch={"tile_lights": _tile_words},
    ),
    "rain_streaks": _falling("rain_streaks", RainStreaksParams, "streak"),
    "snow_fall": _falling("snow_fall", SnowFallParams, "flake"),
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
            Stage(kernel="night_grade_dilate_down", over="strips"),
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
            "grade_open": lambda height, pitch, lights: height * (pitch + 2 * _margin(height)),
            "grade_wide": lambda height, pitch, lights: height * (pitch + 2 * _margin(height)),
        },
    ),
}


def stages(name: str) -> tuple[Stage, ...]:
    """Kernels of a pass, or of what shows the picture, in order."""
    return (name != SHOW and PASSES[name].stages) or (Stage(kernel=name),)
