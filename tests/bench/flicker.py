"""Frame-to-frame change of an edited clip after ego-motion warp: `python -m tests.bench.flicker CLIP night`.

A surface point that two successive frames show is looked up in both by depth and poses; what differs is noise of the
depth, sampling, light that moves (headlights move with the camera), and flicker. Mean absolute difference of 8-bit sRGB
over the pixels that stand still: no vehicles, no sky, and the same depth within 2 % in both frames.
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np
from numpy.typing import NDArray

import aw4d
from aw4d.colour import encode_srgb8
from aw4d.gbuffer import GBuffer
from aw4d.render import edit

Image = NDArray[np.float32]


def change(before: Image, now: Image, was: GBuffer, is_: GBuffer) -> tuple[float, float]:
    """Mean absolute difference of two 8-bit images after warp, in codes, and the share of pixels followed."""
    world = is_.camera.to_world(is_.camera.unproject(is_["depth"]))
    place = was.camera.to_camera(world)
    u, v, z = np.moveaxis(was.camera.project(place), -1, 0)
    at = u.astype(np.float32), v.astype(np.float32)
    depth = cv2.remap(was["depth"], *at, cv2.INTER_LINEAR, borderValue=0)
    seen = (np.abs(depth - z) < 0.02 * z) & ~is_["sky"] & (is_["vehicle"] == 0)
    warped = cv2.remap(before.astype(np.float32), *at, cv2.INTER_LINEAR)
    return float(np.abs(warped - now)[seen].mean()), float(seen.mean())


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
    planes = ("rgb", "depth", "sky", "vehicle")
    rows: list[tuple[float, float, float]] = []
    last: tuple[GBuffer, Image, Image] | None = None
    for out in edit(clip, args.weather, frames=range(count), assignments=args.set):
        frame = clip.frame(out.index, planes)
        source = encode_srgb8(frame["rgb"]).astype(np.float32)
        image = out.image.astype(np.float32)
        if last is not None:
            was, source_before, before = last
            edited, share = change(before, image, was, frame)
            rows.append((change(source_before, source, was, frame)[0], edited, share))
        last = frame, source, image
    source_mean, edited_mean, share = np.mean(rows, axis=0)
    print(f"{args.weather}, {count} frames, {share:.0%} of the pixels followed")
    print(f"source {source_mean:.2f} codes a frame, edited {edited_mean:.2f}")


if __name__ == "__main__":
    main()
