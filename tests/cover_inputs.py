"""Clips, frames and runs for the tests of the snow that lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import in_camera
from aw4d.params import SnowCoverParams
from aw4d.passes import PASSES
from aw4d.scene import Scene
from aw4d.world.anchor import anchor
from aw4d.world.tracks import track_arguments
from aw4d.world.vehicle_frames import vehicle_frames
from tests import lit_inputs

Array = NDArray[np.float64]
RESULTS = ("albedo", "normal", "roughness", "metallic", "depth", "snow_coverage", "snow_bare", "snow_height")


def looking(
    position: Sequence[float] = (0.0, 1.6, 0.0), *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0
) -> Array:
    """Pose of a camera, angles in degrees: 0 looks along the world's -z, its y axis down."""
    a, b, c = np.radians([yaw, pitch, roll])
    level = np.diag([1.0, -1.0, -1.0])
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    spin = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ level @ tilt @ spin
    pose[:3, 3] = position
    return pose


def box(track: int, position: Sequence[float], *, yaw: float = 0.0) -> Box:
    """A car's box."""
    pose = looking(position, yaw=yaw)
    pose[:3, :3] = pose[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    return Box(track_id=track, category="car", object_to_world=pose, size=(4.2, 1.5, 1.8))


def info(
    poses: Sequence[Array],
    boxes: Sequence[Sequence[Box]] = (),
    *,
    camera: Camera | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> ClipInfo:
    """A clip of these poses, ten frames a second."""
    seen = camera or lit_inputs.frame().camera
    return ClipInfo(
        name="made up",
        width=seen.width,
        height=seen.height,
        K=np.broadcast_to(seen.K, (len(poses), 3, 3)).copy(),
        camera_to_world=np.array(poses),
        times=np.arange(len(poses)) / 10,
        world_origin=origin,
        boxes=[list(held) for held in boxes],
    )


def scene(clip: ClipInfo, index: int, p: SnowCoverParams) -> Scene:
    """A frame's place in the world, as the pass takes it."""
    camera = clip.camera(index)
    world = anchor(camera, float(clip.times[index]), clip.world_origin)
    world |= vehicle_frames(clip, index, vehicle_share=p.vehicle_share)
    world |= track_arguments(clip, index, gauge_m=p.track_gauge_m, width_m=p.track_width_m)
    return Scene(lights=in_camera([], camera), world=world)


def frame(width: int = 96, height: int = 54, seed: int = 0, pose: Array | None = None, **planes: Any) -> GBuffer:
    """Random materials on a ragged surface, half of it rather level; a third sky, half road, some vehicles."""
    rng = np.random.default_rng(seed)
    size = (height, width)
    pose = looking() if pose is None else pose
    source = lit_inputs.frame(width, height, seed, pose)
    level = np.broadcast_to(pose[1, :3], (*size, 3)) + rng.normal(size=(*size, 3)) * 0.3
    level /= np.linalg.norm(level, axis=-1, keepdims=True)
    flat = rng.random(size) < 0.6
    drawn = {
        "normal": np.where(flat[..., None], level, source["normal"]).astype(np.float32),
        "road": rng.random(size) < 0.5,
        "vehicle": (rng.integers(0, 5, size) * (rng.random(size) < 0.4)).astype(np.int32),
    }
    return GBuffer(dict(source) | drawn | planes, camera=source.camera, time=0.0)


def driving(
    frames: int = 12, origin: tuple[float, float, float] = (0.0, 0.0, 0.0), source: GBuffer | None = None
) -> ClipInfo:
    """A clip of a turning drive behind one car, past a parked one."""
    first = looking() if source is None else source.camera.camera_to_world
    poses, boxes = [], []
    for index in range(frames):
        pose = first.copy()
        pose[:3, 3] += np.array([0.02 * index**2, 0.0, -1.1 * index])
        poses.append(pose)
        ahead = pose[:3, 3] + (1.0, -0.9, -12.0 - 0.3 * index)
        boxes.append([box(0, ahead, yaw=3.0 * index), box(2, first[:3, 3] + (4.0, -0.9, -15.0), yaw=80)])
    return info(poses, boxes, camera=None if source is None else source.camera, origin=origin)


def reference(source: GBuffer, held: Scene, p: SnowCoverParams) -> Mapping[str, Array]:
    """The definition of the results, in float64, from the float32 inputs that every backend gets."""
    backend = NumpyBackend()
    planes = backend.upload(source, held)
    backend.run("snow_cover", planes, p)
    return backend.download64(planes, RESULTS)


def on(backend: Any, source: GBuffer, held: Scene, p: SnowCoverParams, *, layers: bool = True) -> dict[str, Any]:
    """The results of an OpenCL backend."""
    wanted = list(PASSES["snow_cover"].layers) if layers else []
    planes = backend.upload(source, held, wanted)
    backend.run("snow_cover", planes, p)
    return backend.download(planes, [name for name in RESULTS if layers or name != "snow_height"])


def check(backend: Any, source: GBuffer, held: Scene, p: SnowCoverParams) -> None:
    """The error bar on every result, with layers and without; normals as vectors, whose size is 1."""
    truth = reference(source, held, p)
    for layers in (True, False):
        for name, found in on(backend, source, held, p, layers=layers).items():
            assert np.isfinite(found).all(), name
            if name == "normal":
                off = np.linalg.norm(found - truth[name], axis=-1)
                largest, p9999 = error(1 + off, np.ones_like(off))
            else:
                assert (found >= 0).all(), name
                largest, p9999 = error(found, truth[name])
            assert largest <= BAR_MAX, f"{name}: {largest:.2e}"
            assert p9999 <= BAR_P9999, f"{name}: {p9999:.2e}"
