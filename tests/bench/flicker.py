"""Frame-to-frame change of an edited clip after ego-motion warp: `python -m tests.bench.flicker CLIP night`.

The clip is edited here and now: no file, no video compression. What is measured: `eval.flicker.Flicker`.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

import aw4d
from aw4d.colour import encode_srgb8
from aw4d.gbuffer import GBuffer
from aw4d.render import edit
from eval.flicker import Change, Flicker
from eval.view import View

Picture = NDArray[np.uint8]


def view(frame: GBuffer) -> View:
    """Geometry of a clip's frame."""
    camera = frame.camera
    return View(
        depth=frame["depth"],
        K=camera.K,
        camera_to_world=camera.camera_to_world,
        sky=frame["sky"],
        moving=frame["vehicle"] > 0,
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clip")
    parser.add_argument("weather")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--frames", type=int, default=0, help="how many; all by default")
    args = parser.parse_args()
    clip = aw4d.load(args.clip)
    count = args.frames or len(clip)
    metric, records = Flicker(), list[Change]()
    last: tuple[Picture, Picture, View] | None = None
    for out in edit(clip, args.weather, frames=range(count), assignments=args.set):
        frame = clip.frame(out.index, ("rgb", "depth", "sky", "vehicle"))
        now = encode_srgb8(frame["rgb"]), out.image, view(frame)
        if last is not None:
            records.append(metric.frame((last[0], now[0]), (last[1], now[1]), (last[2], now[2])))
        last = now
    score = metric.pool(records)
    print(f"{args.weather}, {count} frames, {score.others['share of pixels']:.0%} of the pixels followed")
    print(f"source {score.others['source']:.2f} codes a frame, edited {score.value:.2f}")


if __name__ == "__main__":
    main()
