"""What a clip holds, its ranges and calibration, what is missing and what that disables."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from aw4d.clip import Clip
from aw4d.gbuffer import PLANES
from aw4d.passes import PASSES

_SAMPLES = 5  # frames looked at for ranges


def describe(clip: Clip) -> dict[str, Any]:
    """The same as JSON: sizes, calibration, range of every plane over a few frames, what is missing."""
    info = clip.info
    chosen = sorted(set(np.linspace(0, len(clip) - 1, _SAMPLES).round().astype(int).tolist()))
    ranges: dict[str, list[float]] = {}
    for index in chosen:
        frame = clip.frame(index)
        for name in frame:
            low, high = float(frame[name].min()), float(frame[name].max())
            seen = ranges.get(name, [low, high])
            ranges[name] = [min(seen[0], low), max(seen[1], high)]
    moved = float(np.linalg.norm(np.diff(info.camera_to_world[:, :3, 3], axis=0), axis=1).sum())
    return {
        "name": info.name,
        "frames": len(clip),
        "fps": info.fps,
        "size": [info.width, info.height],
        "K": info.K[0].tolist(),
        "path_length_m": moved,
        "sky_depth_m": info.sky_depth_m,
        "environment": info.environment,
        "ranges_on_frames": chosen,
        "ranges": ranges,
        "lidar": clip.points(0) is not None,
        "boxes": sum(len(clip.boxes(i)) for i in range(len(clip))),
        "missing": {plane: _disables(plane) for plane in PLANES if plane not in clip.planes},
        "provenance": info.provenance,
        "approximations": info.approximations,
        "licence": info.licence,
    }


def _disables(plane: str) -> list[str]:
    return [name for name, entry in PASSES.items() if plane in entry.reads]


def show(clip: Clip, console: Console) -> None:
    """Print the description for people."""
    d = describe(clip)
    fx, fy, cx, cy = d["K"][0][0], d["K"][1][1], d["K"][0][2], d["K"][1][2]
    width, height = d["size"]
    console.print(f"[bold]{d['name']}[/]: {d['frames']} frames, {width}x{height}, {d['fps']:.1f} a second")
    console.print(f"fx {fx:.1f}  fy {fy:.1f}  cx {cx:.1f}  cy {cy:.1f} px; travels {d['path_length_m']:.1f} m")
    table = Table()
    for column in ("plane", "unit", "range", "from"):
        table.add_column(column, overflow="fold")
    for name, (low, high) in d["ranges"].items():
        table.add_row(name, PLANES[name].unit, f"{low:.4g} … {high:.4g}", d["provenance"].get(name, ""))
    console.print(table)
    sky = "none" if d["sky_depth_m"] is None else f"{d['sky_depth_m']:.1f} m"
    console.print(f"sky depth {sky}; LiDAR {'yes' if d['lidar'] else 'no'}; {d['boxes']} boxes")
    for plane, disabled in d["missing"].items():
        console.print(f"no {plane}: " + (f"{', '.join(disabled)} cannot run" if disabled else "nothing needs it yet"))
    for sentence in d["approximations"]:
        console.print(f"- {sentence}")
    if d["licence"]:
        console.print(f"Licence of the recording: {d['licence']}")
