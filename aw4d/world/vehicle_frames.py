"""Frames in which snow lies: the world's, and every vehicle's own, so that a vehicle takes its snow along."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.extract.vehicles import is_vehicle
from aw4d.lights.vehicles import moving_vehicles
from aw4d.params import VehicleLightParams
from aw4d.world.anchor import anchor

Array = NDArray[np.float64]


def vehicle_frames(
    info: ClipInfo, index: int, *, vehicle_share: float, moving: VehicleLightParams | None = None
) -> dict[str, Any]:
    """Arguments by name: tables of the frames of one picture, row 0 the world's, and which vehicle has which row.

    Parameters
    ----------
    info
        Cameras and boxes of a clip; a vehicle's id in the plane `vehicle` is its box's track + 1.
    index
        Number of the picture.
    vehicle_share
        Share of the snow that a vehicle which drives keeps.
    moving
        From which speed on it drives.

    Returns
    -------
    dict
        `vehicle_row` (ids,) int32, 0 where a vehicle has no box; `vehicle_ids`; `vehicle_block` (n, 2) int32 numbers of
        the blocks, x and z: a vehicle's id stands for its own, so that no two carry the same snow; `vehicle_frame`
        (n, 24) float32 rotation from the camera and the camera's place in the frame [m], each with what rounding took
        off it; `vehicle_kept` (n,) float32.
    """
    camera = info.camera(index)
    boxes = [box for box in info.boxes[index] if is_vehicle(box)] if info.boxes else []
    drive = moving_vehicles(info, moving or VehicleLightParams())
    world = anchor(camera, 0.0, info.world_origin)
    rows = np.zeros(max((box.track_id for box in boxes), default=-1) + 2, dtype=np.int32)
    blocks, frames, kept = [world["block"][[0, 2]]], [_world_row(world)], [1.0]
    for row, box in enumerate(boxes, start=1):
        rows[box.track_id + 1] = row
        blocks.append(np.array([box.track_id + 1, 0], dtype=np.int32))
        frames.append(_row(box.object_to_world, camera))
        kept.append(vehicle_share if box.track_id in drive else 1.0)
    return {
        "vehicle_row": rows,
        "vehicle_ids": len(rows),
        "vehicle_block": np.array(blocks, dtype=np.int32),
        "vehicle_frame": np.array(frames, dtype=np.float32),
        "vehicle_kept": np.array(kept, dtype=np.float32),
    }


def _world_row(world: dict[str, Any]) -> NDArray[np.float32]:
    return np.concatenate([world[name] for name in ("to_world", "to_world_lo", "eye", "eye_lo")])


def _row(object_to_world: Array, camera: Camera) -> NDArray[np.float32]:
    """Rotation from the camera to the object and the camera's place in its frame, each as hi and lo."""
    axes = object_to_world[:3, :3]
    R = (axes.T @ camera.camera_to_world[:3, :3]).ravel()
    eye = (camera.camera_to_world[:3, 3] - object_to_world[:3, 3]) @ axes
    parts = [R.astype(np.float32), eye.astype(np.float32)]
    lo = [(exact - hi).astype(np.float32) for exact, hi in zip((R, eye), parts, strict=True)]
    return np.concatenate([parts[0], lo[0], parts[1], lo[1]])
