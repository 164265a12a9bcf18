"""An edit from the command to the file, beside only decoding and encoding the same frames: `python -m
tests.bench.whole_way CLIP [WEATHER ...] [--device N]`.

Both are processes of their own, their start included, with the same planes decoded, the same codec settings and the
same threads. The one that only decodes and encodes writes the recorded pictures.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from aw4d.clip import Clip
from aw4d.colour import encode_srgb8
from aw4d.io.video import VideoWriter
from aw4d.overlap import mapped_ahead

BASE = "--only-decode-and-encode"


@dataclass(frozen=True, kw_only=True)
class Run:
    """Seconds of a process: on the wall, and of all cores together."""

    wall: float
    cores: float


def timed(command: list[str]) -> Run:
    """Run a command to its end."""
    before, start = os.times(), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - start, os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return Run(wall=wall, cores=used)


def only_decode_and_encode(path: Path, out: Path, planes: list[str]) -> None:
    """What it takes to read the frames and to write as many: the planes of an edit, and the recorded picture."""
    clip = Clip(path)
    decoded = tuple(dict.fromkeys(("rgb", *planes)))
    with VideoWriter(out, fps=clip.info.fps) as writer:
        for frame in mapped_ahead(partial(clip.frame, planes=decoded), range(len(clip))):
            writer.write(encode_srgb8(frame["rgb"]))


def main() -> None:
    """Measure every weather and print a line each."""
    from aw4d.pipeline import plan
    from aw4d.weathers import WEATHERS

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clip", type=Path)
    parser.add_argument("weathers", nargs="*", default=list(WEATHERS))
    parser.add_argument("--device")
    arguments = parser.parse_args()
    clip = Clip(arguments.clip)
    print("| weather | edit [s] | cores busy | first frame [s] | only decoded and encoded [s] | ratio |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.mp4"
        base: dict[tuple[str, ...], Run] = {}
        for weather in arguments.weathers:
            planes = tuple(sorted(plan(clip, weather).planes))
            if planes not in base:
                base[planes] = timed(
                    [sys.executable, "-m", "tests.bench.whole_way", BASE, str(clip.path), str(out), *planes]
                )
            command = [
                sys.executable,
                "-m",
                "aw4d.cli",
                "--quiet",
                "edit",
                str(clip.path),
                "-w",
                weather,
                "-o",
                str(out),
            ]
            run = timed(command + ["--overwrite"] + (["--device", arguments.device] if arguments.device else []))
            first = json.loads(out.with_suffix(".json").read_text(encoding="utf-8")).get("first_frame_seconds")
            print(
                f"| `{weather}` | {run.wall:.2f} | {run.cores / run.wall:.2f} | {first} | {base[planes].wall:.2f} "
                f"({base[planes].cores / base[planes].wall:.2f} cores) | {run.wall / base[planes].wall:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    if sys.argv[1] == BASE:
        only_decode_and_encode(Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:])
    else:
        main()
