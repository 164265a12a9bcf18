"""Which passes run for a clip and a weather, with which parameters and lights, and which are skipped and why."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import Backend
from aw4d.clip import Clip
from aw4d.environment import rendered
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.lighting import Lighting, lighting
from aw4d.lights.air_floor import air_floor
from aw4d.lights.light import Light
from aw4d.params import AmbientParams, FogParams, Params
from aw4d.passes import PASSES
from aw4d.quality import DEFAULT_QUALITY
from aw4d.scene import Scene
from aw4d.weathers import WEATHERS, Settings, find, nearest, parts
from aw4d.weathers import settings as weather_settings
from aw4d.world import world_arguments
from aw4d.world.sizes import rain_extinction, snow_extinction

log = logging.getLogger("aw4d")
LIGHT_LAYER = "light-"  # radiance of one light: the layer's name goes on with the light's


@dataclass(frozen=True, kw_only=True)
class Step:
    """One pass with its parameters."""

    name: str
    params: Params


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What an edit does to every frame.

    Parameters
    ----------
    weather, quality
        Their names.
    steps
        Passes in order.
    skipped
        Passes that would change nothing, with the reason.
    lighting
        Lights and environment.
    settings
        The parameters it was made from.
    planes
        Planes that must be read from the clip, no others.
    """

    weather: str
    quality: str
    steps: tuple[Step, ...]
    skipped: dict[str, str]
    lighting: Lighting
    settings: Settings
    planes: tuple[str, ...]

    def scene(self, index: int, frame: GBuffer | None = None, *, alone: Light | None = None) -> Scene:
        """What lights a frame, or one local light alone, and where the frame is in the world.

        Without the frame's planes lights of vehicles are where the boxes have them, not where the picture shows them.
        """
        info, camera = self.lighting.info, self.lighting.info.camera(index)
        lit = self.lighting.alone(alone, camera) if alone else self.lighting.scene(index, camera, frame)
        passes = [step.name for step in self.steps]
        if "fog" in passes:
            lights = dataclasses.replace(lit.lights, light_air_floor=air_floor(lit.lights, camera, self.settings.fog))
            lit = dataclasses.replace(lit, lights=lights)
        return dataclasses.replace(lit, world=world_arguments(info, self.settings, passes, index))

    @property
    def layers(self) -> dict[str, int]:
        """Layers that the steps can give, with their channels."""
        return {layer: n for step in self.steps for layer, n in PASSES[step.name].layers.items()}


def plan(clip: Clip, weather: str, assignments: Sequence[str] = (), quality: str = DEFAULT_QUALITY) -> Plan:
    """Decide what runs under a weather with `group.field=value` assignments over its own parameters and a quality's.

    Raises
    ------
    InputError
        The weather, the quality or a parameter is unknown or out of range, the clip lacks a plane that a pass reads, or
        a file of lights, a map or frames are wrong.
    """
    settings = weather_settings(weather, assignments, quality)
    _warn_of_unused(weather, assignments)
    lit = lighting(clip, settings)
    settings = _resolved(settings, lit, find(weather).passes)
    steps: list[Step] = []
    skipped: dict[str, str] = {}
    for name in find(weather).passes:
        params = getattr(settings, name)
        if reason := _idle(name, params, clip, lit, steps):
            skipped[name] = reason
            continue
        _check_planes(clip, name, made_before={plane for step in steps for plane in PASSES[step.name].writes})
        steps.append(Step(name=name, params=params))
    return Plan(
        weather=weather,
        quality=quality,
        steps=tuple(steps),
        skipped=skipped,
        lighting=lit,
        settings=settings,
        planes=_planes(clip, steps),
    )


def _warn_of_unused(weather: str, assignments: Sequence[str]) -> None:
    """Say which assignments change nothing, since the weather has nothing of that kind."""
    used = {*find(weather).passes, *parts(weather)}
    for text in assignments:
        group = text.partition(".")[0].strip()
        if group in {*PASSES, *WEATHERS} - used:
            log.warning("--set %s changes nothing: %s has no %s", text, weather, group)


def _resolved(settings: Settings, lit: Lighting, passes: Sequence[str]) -> Settings:
    """Settings with what follows from the rest: the fog's colour is the surroundings' mean radiance; rain and snow that
    fall are fog, too. Those few drops and flakes that are drawn by themselves count in it as well."""
    fog = settings.fog
    falling = 0.0
    if "rain_streaks" in passes:
        falling += rain_extinction(settings.rain_streaks.rate_mm_h)
    if "snow_fall" in passes:
        falling += snow_extinction(settings.snow_fall.rate_mm_h)
    if falling > 0 and fog.alpha > 0:
        assert fog.sigma_s is not None  # set by __post_init__
        fog = dataclasses.replace(fog, visibility_m=None, sigma_s=fog.sigma_s + falling / fog.alpha)
    if fog.color is None:
        red, green, blue = (float(c) / lit.white_cd_m2 for c in lit.environment.mean_radiance())
        fog = dataclasses.replace(fog, color=(red, green, blue))
    return dataclasses.replace(settings, fog=fog)


def _check_planes(clip: Clip, name: str, made_before: set[str]) -> None:
    needed = set(PASSES[name].reads) - set(PASSES[name].optional) - made_before
    if missing := sorted(needed - set(clip.planes)):
        raise InputError(f"{clip.path}: {name} needs the plane {', '.join(missing)}, which this clip does not have")


def _planes(clip: Clip, steps: Sequence[Step]) -> tuple[str, ...]:
    """Planes to read: what the steps take before one of them has made it anew, and the vehicles on which lamps shine.

    Where the surroundings light all of the picture anew, the recorded one is not read.
    """
    wanted: list[str] = []
    made: set[str] = set()
    for step in steps:
        reads, writes = PASSES[step.name].reads, PASSES[step.name].writes
        wanted += [plane for plane in reads if plane not in made]
        made |= set(writes)
    if "rgb" not in made:
        wanted.append("rgb")
    if any(step.name == "spot_lights" for step in steps):
        wanted.append("vehicle")
    return tuple(dict.fromkeys(plane for plane in wanted if plane in clip.planes))


# The amount without which a pass changes nothing, and the passes that must run, any of them, for it to have work.
_AMOUNT = {
    "snow_cover": "depth_cm",
    "wet_ground": "wetness",
    "puddles": "share",
    "ripples": "rate_mm_h",
    "snow_fall": "rate_mm_h",
    "rain_streaks": "rate_mm_h",
}
_AFTER = {"harmonize": ("spot_lights",), "ripples": ("puddles",), "reflections": ("wet_ground", "puddles")}


def _idle(name: str, params: Params, clip: Clip, lit: Lighting, steps: Sequence[Step]) -> str:
    """Why a pass would change nothing; empty where it would."""
    if isinstance(params, FogParams) and params.extinction == 0 and params.beta == 0:
        return "the extinction is 0"
    if isinstance(params, AmbientParams) and params.frames:
        return "frames of a renderer are given"
    if name == "spot_lights" and "emissive" not in clip.planes and not any(map(lit.lights, range(len(clip)))):
        return "there are no lights"
    if name in _AFTER and not {step.name for step in steps} & set(_AFTER[name]):
        return f"{' and '.join(_AFTER[name])} did nothing"
    by_amount = name in _AMOUNT and getattr(params, "convention", "physical") == "physical"
    if by_amount and getattr(params, _AMOUNT[name]) == 0:
        return f"{_AMOUNT[name]} is 0"
    return ""


def check_layers(made: Plan, layers: Sequence[str]) -> None:
    """Refuse layers that no step of the plan gives."""
    for layer in layers:
        if layer not in made.layers:
            raise InputError(f"--layers: no step gives {layer!r}{nearest(layer, made.layers)}")


def prepare(frame: GBuffer, made: Plan, index: int) -> GBuffer:
    """A frame of the clip as the steps take it: with all that shines by itself, over another renderer's light.

    What only the lamps are placed by stays here.
    """
    if made.settings.ambient.frames:
        frame = frame.with_plane("rgb", rendered(Path(made.settings.ambient.frames), index, frame.camera.shape))
    lit = any(step.name == "spot_lights" for step in made.steps)
    if lit and (emissive := made.lighting.emissive(frame, index)) is not None:
        frame = frame.with_plane("emissive", emissive)
    return frame.only({"rgb", *(plane for step in made.steps for plane in PASSES[step.name].reads)})


def inputs(frame: GBuffer, made: Plan, index: int) -> tuple[GBuffer, Scene]:
    """What a backend takes of a frame of the clip: its planes as the steps take them, and what lights it."""
    return prepare(frame, made, index), made.scene(index, frame)


def render(
    backend: Backend, frame: GBuffer, made: Plan, index: int, layers: Sequence[str] = ()
) -> dict[str, NDArray[np.float32]]:
    """One frame through the plan: `rgb` scene-linear (H, W, 3), and the layers asked for.

    A pure function of clip, plan and index: any frame alone comes out as in the whole run.
    """
    return begin(backend, *inputs(frame, made, index), made, layers)()


def begin(
    backend: Backend,
    frame: GBuffer,
    scene: Scene,
    made: Plan,
    layers: Sequence[str] = (),
    pictures: Sequence[str] = ("rgb",),
) -> Callable[[], dict[str, NDArray[Any]]]:
    """Start on what `inputs` gave; what is returned waits for what `render` gives. Until then the next can be begun.

    `pictures` are "rgb", scene-linear, and `IMAGE`, or one of both.
    """
    planes = backend.upload(frame, scene, layers)
    for step in made.steps:
        backend.run(step.name, planes, step.params)
    return backend.fetch(planes, [*pictures, *layers])


def each_light(backend: Backend, frame: GBuffer, made: Plan, index: int) -> dict[str, NDArray[np.float32]]:
    """Radiance of every local light alone, by the layer's name; those that reach no surface of the frame left out."""
    step = next((step for step in made.steps if step.name == "spot_lights"), None)
    if step is None:
        return {}
    ground = [before for before in made.steps if not {"rgb", "direct"} & set(PASSES[before.name].writes)]
    dark = frame.with_plane("emissive", np.zeros((*frame.camera.shape, 3), dtype=np.float32))
    out = {}
    for light in made.lighting.lights(index, frame):
        planes = backend.upload(dark, made.scene(index, alone=light))
        for before in ground:
            backend.run(before.name, planes, before.params)
        backend.run(step.name, planes, step.params)
        radiance = backend.download(planes, ["direct"])["direct"]
        if radiance.any():
            out[LIGHT_LAYER + light.name] = radiance
    return out


def before_grading(made: Plan) -> Plan:
    """The plan up to the night's grading."""
    names = [step.name for step in made.steps]
    return dataclasses.replace(made, steps=made.steps[: names.index("night_grade")])
