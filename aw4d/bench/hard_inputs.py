"""Inputs at the limits of what a pass admits: small made-up frames, whatever of them is hard said in a few words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.environment import Environment, arrays, environment
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import Light, in_camera
from aw4d.params import AmbientParams, Params
from aw4d.passes import PASSES, WORKING
from aw4d.scene import Scene
from aw4d.weathers import Settings
from aw4d.world import world_arguments

Planes = Mapping[str, NDArray[Any]]
HEIGHT_M = 1.6  # of the camera above the road
FARTHEST_M = 150.0  # of the road
WHITE_CD_M2 = 1_000.0
INDEX = 1  # of the frame, the middle one of three
FOG_COLOR = (0.5, 0.55, 0.6)
FEW = 90  # drops and flakes, more than a word of bits holds


def turned(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> NDArray[np.float64]:
    """Rotation from camera to world, (3, 3); angles in degrees, at 0 the camera looks along the world's -z."""
    level = np.diag([1.0, -1.0, -1.0])
    return np.asarray(level @ Rotation.from_euler("yxz", [yaw, pitch, roll], degrees=True).as_matrix())


def lamp(position: Sequence[float] = (2.0, -1.0, 9.0), **changes: Any) -> Light:
    """A spot that hangs before the camera, in its frame; `changes` are fields of `Light`."""
    x, y, z = (float(p) for p in position)
    own: dict[str, Any] = {"kind": "spot", "direction": (0.1, 1.0, 0.2), "intensity": (30.0, 25.0, 18.0)}
    return Light(**(own | {"position": (x, y, z), "outer_deg": 50.0, "frame": "camera"} | changes))


USUAL = (lamp(), lamp((-1.0, 0.5, 4.0), kind="point"), lamp(kind="directional", intensity=(2.0, 1.9, 1.7)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Scenery:
    """What a frame shows and how it is seen.

    Parameters
    ----------
    size
        (width, height) [px].
    seed
        Of all that is random in it.
    rotation
        Camera to world, (3, 3).
    origin, place
        [m] of the recording's world; and of the camera in it, on the road.
    time
        [s] since the clip's first frame.
    preset
        Of the surroundings.
    lights
        Local lights.
    params
        What is set of the pass' parameters.
    planes
        Planes in place of those that are drawn, made from these.
    """

    size: tuple[int, int] = (33, 7)
    seed: int = 0
    rotation: NDArray[np.float64] = field(default_factory=turned)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    place: tuple[float, float] = (0.7, -0.4)
    time: float = 3.3
    preset: str = "overcast"
    lights: tuple[Light, ...] = USUAL
    params: Mapping[str, Any] = field(default_factory=dict)
    planes: Callable[[GBuffer], Planes] = lambda source: {}


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One pass on one input: all that a backend needs to run it.

    Parameters
    ----------
    step
        Name of the pass.
    frame, scene, params
        What the pass takes.
    working
        Planes that another pass would have written.
    """

    step: str
    frame: GBuffer
    scene: Scene
    params: Params
    working: Planes


def trial(name: str, scenery: Scenery) -> Trial:
    """A pass in a scenery.

    Raises
    ------
    InputError
        A parameter is out of its range, or a plane breaks its rule.
    """
    info = _clip(scenery)
    camera, params = info.camera(INDEX), _params(name, scenery.params)
    drawn = _drawn(camera, scenery.seed)
    frame = GBuffer({**drawn, **scenery.planes(drawn)}, camera=camera, time=scenery.time)
    settings = Settings(**{name: params})  # type: ignore[arg-type]
    return Trial(
        step=name,
        frame=frame,
        params=params,
        scene=Scene(
            lights=in_camera(scenery.lights, camera),
            environment=arrays(_around(scenery.preset), camera, WHITE_CD_M2).arguments(),
            world=world_arguments(info, settings, [name], INDEX),
        ),
        working=_working(name, frame, scenery.seed),
    )


def _params(name: str, given: Mapping[str, Any]) -> Params:
    own: dict[str, Any] = {"fog": {"color": FOG_COLOR}, "rain_streaks": {"drops": FEW}, "snow_fall": {"flakes": FEW}}
    return PASSES[name].params(**(own.get(name, {}) | dict(given)))


@lru_cache(maxsize=8)
def _around(preset: str) -> Environment:
    return environment(AmbientParams(preset=preset))  # type: ignore[arg-type]


def _clip(scenery: Scenery) -> ClipInfo:
    """Three frames of a drive behind a car, past a parked one."""
    width, height = scenery.size
    focal = 0.8 * width + 1
    K = np.array([[focal, 0, width / 2 - 0.3], [0, focal, height / 2 + 0.2], [0, 0, 1]])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = scenery.rotation
    ways = np.arange(3)[:, None] * scenery.rotation[:, 2] * (1.0, 0.0, 1.0)
    poses[:, :3, 3] = np.array([scenery.place[0], HEIGHT_M, scenery.place[1]]) + ways
    return ClipInfo(
        name="hard",
        width=width,
        height=height,
        K=np.tile(K, (3, 1, 1)),
        camera_to_world=poses,
        times=scenery.time + np.arange(-INDEX, 3 - INDEX) / 10,
        world_origin=scenery.origin,
        boxes=[
            [_car(1, pose[:3, 3] + (1.0, -0.9, -9.0)), _car(2, poses[0, :3, 3] + (-3.0, -0.9, -7.0))] for pose in poses
        ],
    )


def _car(track: int, centre: NDArray[np.float64]) -> Box:
    pose = np.eye(4)
    pose[:3, 3] = centre
    return Box(track_id=track, category="car", object_to_world=pose, size=(4.2, 1.5, 1.8))


def _drawn(camera: Camera, seed: int) -> GBuffer:
    """Random materials on a level road below the camera and a ragged wall above it, half of which is sky."""
    rng = np.random.default_rng(seed)
    rays, R = camera.rays(), camera.camera_to_world[:3, :3]
    fall = -(rays @ R.T)[..., 1]
    ground = fall > HEIGHT_M / FARTHEST_M
    leaning = rng.normal(size=rays.shape)
    leaning *= -np.sign(np.einsum("...c,...c", leaning, rays))[..., None]  # faces the eye
    normal = np.where(ground[..., None], R[1] + 0.03 * leaning, leaning)
    wall = np.exp(rng.uniform(np.log(2), np.log(120), camera.shape))
    planes = {
        "rgb": rng.random(rays.shape),
        "depth": np.where(ground, HEIGHT_M / np.maximum(fall, 1e-9), wall),
        "normal": normal / np.linalg.norm(normal, axis=-1, keepdims=True),
        "albedo": rng.random(rays.shape),
        "roughness": rng.random(camera.shape),
        "metallic": rng.random(camera.shape) < 0.3,
        "emissive": rng.random(rays.shape) * (rng.random((*camera.shape, 1)) < 0.05),
    }
    masks = {
        "sky": ~ground & (rng.random(camera.shape) < 0.5),
        "road": ground & (rng.random(camera.shape) < 0.9),
        "vehicle": (rng.integers(1, 4, camera.shape) * (rng.random(camera.shape) < 0.2)).astype(np.int32),
    }
    numbers = {name: np.asarray(plane, dtype=np.float32) for name, plane in planes.items()}
    return GBuffer(numbers | masks, camera=camera, time=0.0)


def _working(name: str, frame: GBuffer, seed: int) -> Planes:
    rng = np.random.default_rng(seed + 1)
    shape = frame.camera.shape
    wanted = [plane for plane in PASSES[name].reads if plane in WORKING]
    drawn = {plane: rng.random((*shape, 3) if WORKING[plane] == 3 else shape, dtype=np.float32) for plane in wanted}
    return {plane: np.where(rng.random() < 0.9, values, 0).astype(np.float32) for plane, values in drawn.items()}
