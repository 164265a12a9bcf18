"""Frames of the KITTI drive with human labels, for tests that measure against them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.io.kitti import open_kitti
from aw4d.io.source import Source

FIRST = 10  # number of the first frame of the excerpt
ROAD, SKY, CAR = 7, 23, 26  # Cityscapes labelIds
VOID = 6  # labelIds up to this one are not judged


@dataclass(frozen=True, kw_only=True)
class Scan:
    """One frame as the recording gives it: picture, camera, returns (N, 3) and their reflectance, boxes."""

    rgb: NDArray[np.uint8]
    camera: Camera
    points: NDArray[np.float32]
    reflectance: NDArray[np.float32]
    boxes: list[Box]


@lru_cache(maxsize=1)
def _source(drive: Path) -> Source:
    return open_kitti(drive)


@lru_cache(maxsize=4)
def scan(drive: Path, number: int) -> Scan:
    """The frame of this number in the drive."""
    source, index = _source(drive), number - FIRST
    points = source.points(index)
    assert points is not None
    return Scan(
        rgb=source.rgb(index),
        camera=source.info.camera(index),
        points=points[:, :3],
        reflectance=points[:, 3],
        boxes=source.info.boxes[index],
    )


def label_iou(drive: Path, number: int, mask: NDArray[np.bool_], label: int) -> float:
    """Intersection over union of a mask and a human label, void left out."""
    path = drive / "semantic_gt" / f"{number:010d}_labelIds.png"
    labels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert labels is not None, path
    judged, truth = labels > VOID, labels == label
    return float(np.count_nonzero(mask & truth & judged) / np.count_nonzero((mask | truth) & judged))
