"""An environment: the light that comes from all around, in absolute units, and its arrays for a frame."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

import reference_numpy.brdf
import reference_numpy.environment
from aw4d import cache
from aw4d.camera import Camera
from aw4d.environment import latlong, prefilter
from aw4d.environment.latlong import level_irradiance, sample, solid_angles
from aw4d.environment.prefilter import SIZE
from reference_numpy.environment import octahedral_grid
from reference_numpy.srgb import LUMINANCE

Array = NDArray[np.float64]

# What the tables follow from beside the light.
_MAKERS = cache.source_of(prefilter, latlong, reference_numpy.environment, reference_numpy.brdf)

BACKDROP = 512  # largest side of the table that the sky shows; half a texel is 0.2 degrees


@dataclass(frozen=True, kw_only=True, eq=False)
class Environment:
    """Light from all around.

    Parameters
    ----------
    radiance
        (H, W, 3) lat-long map, linear Rec. 709 whose luminance is in cd/m2, without the sun.
    backdrop
        (H, W, 3) the same as the sky shows it; it may go on below the horizon where `radiance` has ground.
    sun_direction
        (3,) unit, towards the sun, world frame; of no meaning where there is none.
    sun_irradiance
        (3,) of a surface square to the sun; its luminance is in lux. 0: no sun.
    """

    radiance: Array
    backdrop: Array
    sun_direction: Array
    sun_irradiance: Array

    @property
    def illuminance(self) -> float:
        """Of a level surface, sky and sun together [lux]."""
        return float(level_irradiance(self.radiance) @ LUMINANCE) + self.sun_illuminance

    @property
    def sun_illuminance(self) -> float:
        """Of a level surface, by the sun alone [lux]."""
        return float(self.sun_irradiance @ LUMINANCE) * max(float(self.sun_direction[1]), 0.0)

    def mean_radiance(self) -> Array:
        """Over all directions, the sun included, (3,): what a thick fog in it looks like."""
        height, width = self.radiance.shape[:2]
        share = solid_angles(height, width) / (4 * np.pi)
        return np.asarray((self.radiance * share[..., None]).sum(axis=(0, 1)) + self.sun_irradiance / (4 * np.pi))

    @cached_property
    def tables(self) -> dict[str, Array]:
        """Its tables, in absolute units, by argument name; made once, and kept on disk."""
        return cache.kept("sky", (_MAKERS, self.radiance, self.backdrop), self._make_tables)

    def _make_tables(self) -> dict[str, Array]:
        size = int(min(max(2 * self.backdrop.shape[0], SIZE), BACKDROP))
        return prefilter.tables(self.radiance) | {"env_backdrop": sample(self.backdrop, octahedral_grid(size))}


@dataclass(frozen=True, kw_only=True, eq=False)
class EnvironmentArrays:
    """An environment on a frame's scale and in its camera's frame, by the argument names of the pass `ambient`.

    float32; radiance 1 is the picture's white. A texel of a table is RGB and a 0, four floats, so that it is one load.
    """

    env_rotation: NDArray[np.float32]  # (3, 3) camera to world
    env_irradiance: NDArray[np.float32]  # (N, N, 4)
    env_specular: NDArray[np.float32]  # (L, N, N, 4)
    env_brdf: NDArray[np.float32]  # (M, M, LOBES, 4) three numbers of each lobe and a 0
    env_backdrop: NDArray[np.float32]  # (B, B, 4)
    env_zonal: NDArray[np.float32]  # (L, E, 4); E is 0 where the light depends on more than the elevation
    env_colour: NDArray[np.float32]  # (3,)
    sun_direction: NDArray[np.float32]  # (3,) camera frame
    sun_irradiance: NDArray[np.float32]  # (3,)

    def arguments(self) -> dict[str, Any]:
        """Everything by argument name, and the tables' sizes."""
        sizes = {
            "env_levels": len(self.env_specular),
            "env_size": self.env_irradiance.shape[0],
            "env_brdf_size": self.env_brdf.shape[0],
            "env_backdrop_size": self.env_backdrop.shape[0],
            "env_elevations": self.env_zonal.shape[1],
            "sun_on": int(self.sun_irradiance.any()),
        }
        return {field.name: getattr(self, field.name) for field in fields(self)} | sizes


def arrays(environment: Environment, camera: Camera, white_cd_m2: float) -> EnvironmentArrays:
    """An environment as a frame takes it.

    Parameters
    ----------
    environment
        In absolute units.
    camera
        The frame's camera; only its rotation matters.
    white_cd_m2
        Luminance that the picture shows as 1 [cd/m2].
    """
    R = camera.camera_to_world[:3, :3]
    return EnvironmentArrays(
        **_scaled_tables(environment, white_cd_m2),
        env_rotation=np.ascontiguousarray(R, dtype=np.float32),
        sun_direction=(R.T @ environment.sun_direction).astype(np.float32),
        sun_irradiance=(environment.sun_irradiance / white_cd_m2).astype(np.float32),
    )


@lru_cache(maxsize=2)  # the frames of a clip share them
def _scaled_tables(environment: Environment, white_cd_m2: float) -> dict[str, NDArray[np.float32]]:
    tables = dict(environment.tables)
    colour = tables.pop("env_colour").astype(np.float32)
    held = {name: (_texels(table) / white_cd_m2).astype(np.float32) for name, table in tables.items()}
    held |= {"env_brdf": _lobes(), "env_colour": colour}
    for table in held.values():
        table.flags.writeable = False  # so that a backend sees that it has the table already
    return held


def _lobes() -> NDArray[np.float32]:
    """What `prefilter.lobe_table` gives: it depends on nothing, and making it takes a second of a first edit."""
    with resources.files("aw4d.environment").joinpath("lobes.npy").open("rb") as file:
        table: NDArray[np.float32] = np.load(file, allow_pickle=False)
    return table


def _texels(table: Array) -> Array:
    """Texels of three numbers filled up to four; what has four stays as it is."""
    return np.concatenate([table, np.zeros((*table.shape[:-1], 4 - table.shape[-1]))], axis=-1)
