"""Oriented 3D boxes of tracked objects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aw4d.errors import InputError

Array = NDArray[np.float64]

# Signs of the corners along length, height and width: the four at the bottom, then the four above them.
_CORNERS = np.array([(x, y, z) for y in (-1, 1) for x, z in ((1, 1), (1, -1), (-1, -1), (-1, 1))], dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Box:
    """One object's box in one frame.

    Parameters
    ----------
    track_id
        The same number in every frame of the clip, not negative.
    category
        What the recording calls the object, for example "Car".
    object_to_world
        Pose, 4x4, rigid. The origin is the box's centre; axes x forward, y up, z right.
    size
        (length, height, width) [m], along x, y, z.

    Raises
    ------
    InputError
        The pose is not rigid, the size is negative, or a value is not finite.
    """

    track_id: int
    category: str
    object_to_world: Array
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        pose = np.array(self.object_to_world, dtype=np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise InputError(f"object_to_world: expected a finite (4, 4) matrix, got {pose.tolist()}")
        R = pose[:3, :3]
        if not (np.abs(R @ R.T - np.eye(3)) <= 1e-4).all() or np.linalg.det(R) < 0:
            raise InputError(f"object_to_world: expected a rigid transform, got rotation {R.tolist()}")
        size = tuple(float(s) for s in self.size)
        if len(size) != 3 or not np.isfinite(size).all() or min(size) < 0:
            raise InputError(f"size: expected (length, height, width) in metres, not negative, got {self.size}")
        if self.track_id < 0:
            raise InputError(f"track_id: expected a number that is not negative, got {self.track_id}")
        pose.setflags(write=False)
        object.__setattr__(self, "object_to_world", pose)
        object.__setattr__(self, "size", size)

    def corners(self) -> Array:
        """World coordinates of the eight corners [m], (8, 3): the bottom four, then the top four in the same order."""
        local = _CORNERS * np.asarray(self.size) / 2
        return np.asarray(local @ self.object_to_world[:3, :3].T + self.object_to_world[:3, 3], dtype=np.float64)

    def to_object(self, points: ArrayLike) -> Array:
        """Object coordinates of world points [m], (..., 3)."""
        centred = np.asarray(points, dtype=np.float64) - self.object_to_world[:3, 3]
        return np.asarray(centred @ self.object_to_world[:3, :3], dtype=np.float64)

    def contains(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Which world points [m], (..., 3), lie in the box, its surface included; points that are not finite do not."""
        with np.errstate(invalid="ignore"):
            inside = np.abs(self.to_object(points)) <= np.asarray(self.size) / 2
        return np.asarray(inside.all(axis=-1), dtype=np.bool_)

    def to_json(self) -> dict[str, Any]:
        """The box as plain numbers, strings and lists; `from_json` reads it back exactly."""
        return {
            "track_id": int(self.track_id),
            "category": self.category,
            "object_to_world": self.object_to_world.tolist(),
            "size": list(self.size),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Box:
        """Read what `to_json` wrote.

        Raises
        ------
        InputError
            A key is missing or a value is not what a box holds.
        """
        try:
            return cls(
                track_id=int(data["track_id"]),
                category=str(data["category"]),
                object_to_world=np.array(data["object_to_world"], dtype=np.float64),
                size=tuple(data["size"]),
            )
        except InputError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"box: expected track_id, category, object_to_world and size, got {data}") from error
