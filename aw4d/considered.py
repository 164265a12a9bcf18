"""How much of what there is in a frame the passes work on: pixels, tiles, lights, particles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import Backend, Planes
from aw4d.clip import Clip
from aw4d.gbuffer import GBuffer
from aw4d.params import ReflectionsParams
from aw4d.pipeline import Plan, Step, inputs
from aw4d.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Count:
    """Of what a pass could work on, how much it does."""

    step: str
    what: str
    considered: int
    evaluated: int

    def __add__(self, other: Count) -> Count:
        """Counts of the same thing in two frames together."""
        assert (self.step, self.what) == (other.step, other.what)
        return Count(
            step=self.step,
            what=self.what,
            considered=self.considered + other.considered,
            evaluated=self.evaluated + other.evaluated,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Frame:
    """A frame on a backend, right after a step."""

    step: Step
    source: GBuffer
    scene: Scene
    backend: Backend
    planes: Planes

    def plane(self, name: str) -> NDArray[np.float32]:
        """A plane as it is now; 0 where no pass has made it."""
        return self.backend.download(self.planes, [name])[name]

    def count(self, what: str, considered: int, evaluated: np.integer | int) -> Count:
        return Count(step=self.step.name, what=what, considered=int(considered), evaluated=int(evaluated))

    def pixels(self, what: str, on: NDArray[np.bool_]) -> list[Count]:
        return [self.count(what, on.size, np.count_nonzero(on))]


def _local_lights(frame: _Frame) -> list[Count]:
    """Lights that reach any tile's surfaces, and pairs of a light and a tile; without tiles, all lights."""
    lights = len(frame.scene.lights)
    words = frame.backend.scratch("spot_lights", frame.planes, "tile_lights")
    if words is None or not lights:
        return [frame.count("lights", lights, lights)]
    tiles = words.reshape(-1, -(-lights // 32))
    pairs = np.bitwise_count(tiles).sum(axis=1, dtype=np.int64)
    reach = np.bitwise_count(np.bitwise_or.reduce(tiles)).sum()
    return [
        frame.count("lights that reach a tile", lights, reach),
        frame.count("tiles with a light", len(tiles), np.count_nonzero(pairs)),
        frame.count("lights of all tiles", lights * len(tiles), pairs.sum()),
    ]


def _particles(frame: _Frame) -> list[Count]:
    """Particles of the box around the view, and those that show."""
    name = frame.step.name
    held = int(frame.scene.world[f"{name}.particle_count"])
    shown = frame.backend.scratch(name, frame.planes, "particle_shown") if held else None
    return [frame.count("particles of the box that show", held, held if shown is None else int(shown[0]))]


def _air(frame: _Frame) -> list[Count]:
    floor = frame.scene.lights.light_air_floor
    return [frame.count("lights whose glow is taken", len(floor), np.count_nonzero(floor < np.inf))]


def _mirrors(frame: _Frame) -> list[Count]:
    p = frame.step.params
    assert isinstance(p, ReflectionsParams)
    wet = (frame.plane("puddle") > 0) | (frame.plane("wetness") > 0)
    return frame.pixels("pixels that mirror", wet & ~frame.source["sky"] & (frame.plane("roughness") < p.max_roughness))


# What is counted after a pass, by its name.
_COUNTED: dict[str, Callable[[_Frame], list[Count]]] = {
    "snow_cover": lambda frame: frame.pixels("pixels with snow", frame.plane("snow_coverage") > 0),
    "wet_ground": lambda frame: frame.pixels("pixels that are wet", frame.plane("wetness") > 0),
    "puddles": lambda frame: frame.pixels("pixels under puddles", frame.plane("puddle") > 0),
    "ripples": lambda frame: frame.pixels("pixels under puddles", frame.plane("puddle") > 0),
    "ambient": lambda frame: frame.pixels("pixels that are no sky", ~frame.source["sky"]),
    "overcast_sky": lambda frame: frame.pixels("pixels that are sky", frame.source["sky"]),
    "spot_lights": _local_lights,
    "reflections": _mirrors,
    "fog": _air,
    "snow_fall": _particles,
    "rain_streaks": _particles,
}


def counts(clip: Clip, made: Plan, backend: Backend, index: int) -> list[Count]:
    """Run the steps on a frame and count after each."""
    source, scene = inputs(clip.frame(index, made.planes), made, index)
    planes = backend.upload(source, scene)
    found: list[Count] = []
    for step in made.steps:
        backend.run(step.name, planes, step.params)
        frame = _Frame(step=step, source=source, scene=scene, backend=backend, planes=planes)
        found += _COUNTED[step.name](frame) if step.name in _COUNTED else []
    return found
