"""What lights the frames of a clip: lamps that stay, vehicles' lights of each frame, environment, and the exposure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.clip import Clip, ClipInfo
from aw4d.environment import Environment, arrays, environment
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.lights.faces import add_street_lamp_faces
from aw4d.lights.light import Light, in_camera, read_lights, switched_on
from aw4d.lights.poles import pole_lamps
from aw4d.lights.street_lamps import street_lamps
from aw4d.lights.vehicles import add_vehicle_faces, at_faces, vehicle_lights
from aw4d.params import ExposureParams
from aw4d.scene import Scene
from aw4d.weathers import Settings


@dataclass(frozen=True, kw_only=True)
class Lighting:
    """Everything that lights a clip under some settings.

    Parameters
    ----------
    standing
        Lamps that do not move in the world, the ego vehicle's, and those of a file.
    environment
        Sky, ground and sun.
    white_cd_m2
        The luminance that the picture shows as white.
    settings
        What it was made from.
    info
        The clip's boxes and times, for the lights of moving vehicles.
    """

    standing: tuple[Light, ...]
    environment: Environment
    white_cd_m2: float
    settings: Settings
    info: ClipInfo

    def lights(self, index: int, frame: GBuffer | None = None) -> list[Light]:
        """All local lights of a frame; by its planes those of vehicles are where it shows their faces."""
        return [*self.standing, *self._moving(index, frame)]

    def _moving(self, index: int, frame: GBuffer | None = None) -> list[Light]:
        """Lights of the vehicles that move."""
        if not self.settings.lights.vehicles:
            return []
        own = self.settings.vehicle_lights
        found = vehicle_lights(self.info, index, own, white_cd_m2=self.white_cd_m2)
        if frame is not None and "vehicle" in frame:
            found = at_faces(found, self.info, index, frame, own)
        return switched_on(found, self.settings.lights.off)

    def scene(self, index: int, camera: Camera, frame: GBuffer | None = None) -> Scene:
        """What lights a frame, as the passes take it."""
        return self._lit_by(self.lights(index, frame), camera)

    def alone(self, light: Light, camera: Camera) -> Scene:
        """The same with one local light only."""
        return self._lit_by([light], camera)

    def _lit_by(self, lights: list[Light], camera: Camera) -> Scene:
        tables = arrays(self.environment, camera, self.white_cd_m2).arguments()
        return Scene(lights=in_camera(lights, camera), environment=tables)

    def emissive(self, frame: GBuffer, index: int) -> NDArray[np.float32] | None:
        """Radiance that the surfaces send by themselves, (H, W, 3): the clip's own and the lamps'; None for none.

        Traffic lights were recorded at the brightness of their day; they keep it on the picture's scale, as a camera
        that exposes for the night shows them as white-hot as the day's shows them.
        """
        lamps = [light for light in self.standing if light.name.startswith(("street-", "pole-"))]
        burning = frozenset(light.name for light in (self._moving(index) if "vehicle" in frame else ()))
        if not (lamps or burning or "emissive" in frame):
            return None
        traffic = self.settings.lights.traffic and "emissive" in frame
        out = frame["emissive"].copy() if traffic else np.zeros((*frame.camera.shape, 3), dtype=np.float32)
        white = self.white_cd_m2
        if lamps:
            street = self.settings.street_lamps
            add_street_lamp_faces(out, lamps, frame["depth"], frame["sky"], frame.camera, street, white_cd_m2=white)
        if burning:
            own = self.settings.vehicle_lights
            add_vehicle_faces(out, self.info, index, frame, own, white_cd_m2=white, lit=burning)
        return out


def metered_white(illuminance_lux: float, p: ExposureParams) -> float:
    """What shows as white [cd/m2]: a white card's luminance on the ground, E / pi, but no less than the camera can."""
    if p.white_cd_m2 is not None:
        return p.white_cd_m2
    return max(illuminance_lux / math.pi, p.darkest_white_cd_m2) / 2**p.ev


def lighting(clip: Clip, settings: Settings) -> Lighting:
    """Find what lights a clip.

    Raises
    ------
    InputError
        The file of lights or the environment map is wrong.
    """
    around = environment(settings.ambient)
    white = metered_white(around.illuminance, settings.exposure)
    which = settings.lights
    standing = headlights(settings.headlights, white_cd_m2=white)
    if which.street:
        lamps = street_lamps(clip, settings.street_lamps, white_cd_m2=white)
        if not lamps and which.poles:
            lamps = pole_lamps(clip, settings.street_lamps, white_cd_m2=white)
        standing += lamps
    if which.file:
        standing += read_lights(which.file)
    return Lighting(
        standing=tuple(switched_on(standing, which.off)),
        environment=around,
        white_cd_m2=white,
        settings=settings,
        info=clip.info,
    )
