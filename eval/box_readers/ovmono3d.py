"""Detections of OVMono3D (Yao et al. 2024) and other detectors of the Omni3D family: one flat JSON list."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eval.box_readers.frames import by_frame, frame_name
from eval.boxes import Box3D, Boxes
from eval.errors import MetricError
from eval.text_files import entry, read_json

KEYS = "an object with image_id, category_id, score and bbox3D, 8 corners of 3 numbers"


def read_ovmono3d(path: Path, names: Mapping[int, str] | None = None) -> Boxes:
    """Boxes of a results file: a list of objects with image_id, category_id, score and bbox3D.

    `bbox3D` has the eight corners in the camera frame (OpenCV) [m]; a frame's name is its image_id. `bbox`,
    `dimensions` and other keys are not read, since the metric projects the corners.

    Parameters
    ----------
    path
        Results file, such as omni_instances_results.json.
    names
        Name of each category_id, see `read_category_names`; without it the number is the name.

    Raises
    ------
    MetricError
        The file or an entry is not what is expected.
    """
    return boxes_of_ovmono3d(read_json(path), names, path)


def boxes_of_ovmono3d(results: Any, names: Mapping[int, str] | None, source: Path) -> Boxes:
    """Boxes of what a results file holds; see `read_ovmono3d`. `source` is named in errors."""
    if not isinstance(results, list):
        raise MetricError(f"{source}: expected a list of detections, got {type(results).__name__}")
    boxes = []
    for number, result in enumerate(results):
        with entry(source, f"entry {number}", KEYS):
            boxes.append((frame_name(result["image_id"]), _box(result, names)))
    return by_frame(boxes)


def _box(result: Mapping[str, Any], names: Mapping[int, str] | None) -> Box3D:
    number = int(result["category_id"])
    if names is not None and number not in names:
        raise MetricError(f"category_id: expected one of {sorted(names)}, got {number}")
    return Box3D(
        corners=result["bbox3D"],
        category=names[number] if names is not None else str(number),
        score=float(result["score"]),
    )


def read_category_names(path: Path) -> dict[int, str]:
    """Names by category_id from a JSON file with a COCO-style list `categories` of objects with id and name.

    Raises
    ------
    MetricError
        The file or an entry is not what is expected.
    """
    content = read_json(path)
    with entry(path, "categories", 'a list "categories" of objects with id and name'):
        return {int(category["id"]): str(category["name"]) for category in content["categories"]}
