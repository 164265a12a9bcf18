"""Which passes run for a clip and a weather, with which parameters and lights, and which are skipped and why."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import Backend
from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.lights.light import Light, in_camera, read_lights
from aw4d.params import RGB, FogParams, Params
from aw4d.passes import PASSES
from aw4d.weathers import Settings, find, nearest

GREY: RGB = (0.5, 0.5, 0.5)
LUMINANCE = (0.2126, 0.7152, 0.0722)  # Rec. 709


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
    weather
        Its name.
    steps
        Passes in order.
    skipped
        Passes that would change nothing, with the reason.
    lights
        Lights of the scene.
    settings
        The parameters it was made from.
    """

    weather: str
    steps: tuple[Step, ...]
    skipped: dict[str, str]
    lights: tuple[Light, ...]
    settings: Settings

    @property
    def planes(self) -> tuple[str, ...]:
        """Planes that must be read from the clip, no others."""
        return tuple(dict.fromkeys(["rgb", *(name for step in self.steps for name in PASSES[step.name].reads)]))

    @property
    def layers(self) -> dict[str, int]:
        """Layers that the steps can give, with their channels."""
        return {layer: n for step in self.steps for layer, n in PASSES[step.name].layers.items()}


def environment_color(clip: Clip) -> RGB:
    """Mean radiance of the surroundings, half sky and half ground as the clip shows them; grey where it shows neither.

    Its luminance (Rec. 709) in all three channels: the picture's sky is blue because the sun is not in it, while fog is
    lit by both and looks white.
    """
    seen = list(clip.info.environment.values())
    if not seen:
        return GREY
    luminance = float(np.mean(seen, axis=0) @ LUMINANCE)
    return luminance, luminance, luminance


def plan(clip: Clip, weather: str, settings: Settings) -> Plan:
    """Decide what runs.

    Raises
    ------
    InputError
        The weather is unknown, the clip lacks a plane that a pass reads, or the file of lights is wrong.
    """
    lights = [*headlights(settings.headlights), *(read_lights(settings.lights.file) if settings.lights.file else [])]
    fog = settings.fog
    if fog.color is None:
        fog = dataclasses.replace(fog, color=environment_color(clip))
    settings = dataclasses.replace(settings, fog=fog)
    steps, skipped = [], {}
    for name in find(weather).passes:
        missing = [plane for plane in PASSES[name].reads if plane not in clip.planes]
        if missing:
            raise InputError(f"{clip.path}: {name} needs the plane {', '.join(missing)}, which this clip does not have")
        params = getattr(settings, name)
        if reason := _idle(params):
            skipped[name] = reason
        else:
            steps.append(Step(name=name, params=params))
    return Plan(weather=weather, steps=tuple(steps), skipped=skipped, lights=tuple(lights), settings=settings)


def _idle(params: Params) -> str:
    """Why a pass with these parameters would change nothing; empty where it would."""
    if isinstance(params, FogParams) and params.extinction == 0 and params.beta == 0:
        return "the extinction is 0"
    return ""


def check_layers(made: Plan, layers: Sequence[str]) -> None:
    """Refuse layers that no step of the plan gives."""
    for layer in layers:
        if layer not in made.layers:
            raise InputError(f"--layers: no step gives {layer!r}{nearest(layer, made.layers)}")


def render(backend: Backend, frame: GBuffer, made: Plan, layers: Sequence[str] = ()) -> dict[str, NDArray[np.float32]]:
    """One frame through the plan: `rgb` scene-linear (H, W, 3), and the layers asked for.

    A pure function of frame and plan: any frame alone comes out as in the whole run.
    """
    planes = backend.upload(frame, in_camera(made.lights, frame.camera), layers)
    for step in made.steps:
        backend.run(step.name, planes, step.params)
    return backend.download(planes, ["rgb", *layers])
