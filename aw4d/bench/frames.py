"""The frames that are measured: the built-in street at any size, random planes, and a frame of a clip."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from aw4d import street
from aw4d.camera import Camera
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.lights.light import Light, LightArrays, in_camera
from aw4d.params import HeadlightParams
from aw4d.pipeline import Plan

FRAME = 3  # of the street
AT = (1280, 704)  # [px] the size at which peers, knobs and curves are measured


def street_frame(width: int, height: int) -> GBuffer:
    """The street at a size [px]."""
    return street.frame(FRAME, width=width, height=height)


def random_frame(camera: Camera) -> GBuffer:
    """Random materials on a ragged wall 2 to 120 m away, a third of it sky: no two pixels alike, nothing to skip."""
    rng = np.random.default_rng(0)
    size = camera.shape
    ray = camera.rays() / np.linalg.norm(camera.rays(), axis=-1, keepdims=True)
    tilted = rng.normal(size=(*size, 3)) * 0.5 - ray
    tilted *= -np.sign(np.einsum("...c,...c", tilted, ray))[..., None]  # faces the eye
    below = np.arange(size[0])[:, None] >= np.full(size[1], size[0] / 3)
    planes = {
        "rgb": rng.random((*size, 3), dtype=np.float32),
        "depth": np.exp(rng.uniform(np.log(2), np.log(120), size)).astype(np.float32),
        "normal": (tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)).astype(np.float32),
        "albedo": rng.random((*size, 3), dtype=np.float32),
        "roughness": rng.random(size, dtype=np.float32),
        "metallic": (rng.random(size, dtype=np.float32) < 0.3).astype(np.float32),
        "emissive": (rng.random((*size, 3), dtype=np.float32) * (rng.random((*size, 1)) < 0.05)).astype(np.float32),
        "sky": ~below,
        "road": below & (rng.random(size) < 0.5),
        "vehicle": np.zeros(size, np.int32),
        "street_light": np.zeros(size, np.int32),
    }
    return GBuffer(planes, camera=camera, time=FRAME / street.RATE)


def for_camera(made: Plan, camera: Camera) -> Plan:
    """A plan as it would be for a camera of another size: the same lamps and paths."""
    info = made.lighting.info
    K = np.broadcast_to(camera.K, info.K.shape).copy()
    resized = dataclasses.replace(info, width=camera.width, height=camera.height, K=K)
    return dataclasses.replace(made, lighting=dataclasses.replace(made.lighting, info=resized))


def with_planes(frame: GBuffer, names: Sequence[str]) -> GBuffer:
    """The frame with some of its planes alone, as a clip gives those that a plan reads."""
    return GBuffer({name: frame[name] for name in names if name in frame}, camera=frame.camera, time=frame.time)


def eight_of_the_street(camera: Camera) -> LightArrays:
    """The six street lamps ahead that are nearest, and the ego vehicle's pair."""
    heads = camera.to_camera(street.lamps())
    ahead = heads[heads[:, 2] > 0]
    nearest = ahead[np.argsort(np.linalg.norm(ahead, axis=1))[:6]]
    hanging = [_lamp((x, y, z), inner_deg=15, outer_deg=35) for x, y, z in nearest.tolist()]
    return in_camera(hanging + headlights(HeadlightParams(), white_cd_m2=12), camera)


def eight_everywhere(camera: Camera) -> LightArrays:
    """Eight wide spots at the eye: each reaches every pixel, so that nothing can be left out."""
    spots = [
        Light(
            kind="spot",
            position=(0.2 * i - 0.7, -0.5, -1.0),
            direction=(0.0, 0.0, 1.0),
            intensity=(9.0, 9.0, 9.0),
            inner_deg=60,
            outer_deg=80,
            r_max_m=500,
            frame="camera",
        )
        for i in range(8)
    ]
    return in_camera(spots, camera)


def lamps_along(camera: Camera, count: int) -> LightArrays:
    """Street lamps on both sides of a straight road, 30 m apart, from 15 m ahead on, which reach 20 m."""
    ground = camera.camera_to_world[1, 3]
    places = [(-6.0 if i % 2 else 6.0, ground - 7.0, 15.0 + 30.0 * (i // 2)) for i in range(count)]
    return in_camera([_lamp(place, inner_deg=30, outer_deg=70) for place in places], camera)


def _lamp(position: tuple[float, float, float], *, inner_deg: float, outer_deg: float) -> Light:
    return Light(
        kind="spot",
        position=position,
        direction=(0.0, 1.0, 0.0),
        intensity=(30.0, 25.0, 18.0),
        inner_deg=inner_deg,
        outer_deg=outer_deg,
        r_max_m=20,
        frame="camera",
    )
