"""Damaged files for every reader, made from a seed: `python -m tests.fuzz_files FORMAT FROM TO FOLDER` reads some.

Each number stands for one damage of one of the format's files. A reader may read what it gets, or refuse it with an
InputError or a MetricError; any other end is printed, with the number, and nothing more is read.
"""

from __future__ import annotations

import json
import pickle
import resource
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.ingest import ingest
from aw4d.io.frames import open_frames
from aw4d.io.hdr import read_radiance
from aw4d.io.images import exr_channels, read_exr_plane, read_png, read_rgb, write_exr, write_png
from aw4d.io.kitti import open_kitti
from aw4d.io.safe_pickle import read_plain_pickle
from aw4d.io.video import VideoWriter, frame_times, read_video
from aw4d.lights.light import read_lights
from eval import features
from eval.box_readers import read_kitti_tracking, read_nuscenes, read_ovmono3d, read_projection
from eval.errors import MetricError
from tests import made_up
from tests.test_eval_box_readers import TestOVMono3D
from tests.test_io_kitti import CAM_TO_CAM, LABEL, make_drive

MEMORY = 4 * 2**30  # bytes that reading one damaged file may add to what the libraries take
RNG = np.random.default_rng(0)
PICTURE = np.kron(RNG.integers(0, 255, (4, 6, 3)), np.ones((8, 8, 1))).astype(np.uint8)
LAMP = {"kind": "spot", "position": [1, 2, 3], "direction": [0, -1, 0], "intensity": [1, 1, 1], "outer_deg": 30}


@dataclass(frozen=True, kw_only=True)
class Format:
    """How files of a format are made in a folder, which of them are damaged (a pattern), and how they are read."""

    make: Callable[[Path], object]
    damaged: str
    read: Callable[[Path], object]


def _jpeg(path: Path) -> None:
    import cv2

    cv2.imwrite(str(path), PICTURE)


def _hdr(path: Path) -> None:
    import cv2

    cv2.imwrite(str(path), (PICTURE[:24] / 255).astype(np.float32))  # twice as wide as high


def _video(path: Path) -> None:
    with VideoWriter(path, fps=10) as writer:
        for index in range(6):
            writer.write(np.roll(PICTURE, index, axis=1))


def _frames(folder: Path) -> None:
    for name, values in (("rgb", PICTURE), ("depth", np.full(PICTURE.shape[:2], 2560, np.uint16))):
        (folder / name).mkdir()
        write_png(folder / name / "0.png", values)
    (folder / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    (folder / "times.txt").write_text("0.5\n")
    K = [[15.0, 0, 9.5], [0, 15.0, 5.5], [0, 0, 1]]
    (folder / "intrinsics.json").write_text(json.dumps({"K": K}))


def _clip(folder: Path) -> None:
    ingest(made_up.source(2, 24, 16), folder / "a.clip", workers=1)


def _read_clip(folder: Path) -> None:
    clip = Clip(folder / "a.clip")
    for index in range(len(clip)):
        clip.frame(index)
        clip.points(index)


def _read_drive(folder: Path) -> None:
    source = open_kitti(next(folder.glob("*/*_sync")))
    for index in range(len(source.info)):
        source.rgb(index)
        source.points(index) if source.points else None


def _read_frames(folder: Path) -> None:
    source = open_frames(folder)
    source.rgb(0)
    source.planes(0) if source.planes else None


def _json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1))


_RESULT = {"sample_token": "a", "translation": [1, 2, 3], "size": [1, 2, 3], "rotation": [1, 0, 0, 0]}
_NUSCENES = {"results": {"a": [_RESULT | {"detection_name": "car", "detection_score": 0.5}]}}
_ARRAYS = {"ref": RNG.normal(size=(8, 3)), "gen": RNG.normal(size=(8, 3))}
_POSES = {"a": np.eye(4)}

FORMATS: dict[str, Format] = {
    "png": Format(
        make=lambda f: write_png(f / "a.png", PICTURE), damaged="a.png", read=lambda f: read_png(f / "a.png")
    ),
    "jpeg": Format(make=lambda f: _jpeg(f / "a.jpg"), damaged="a.jpg", read=lambda f: read_rgb(f / "a.jpg")),
    "exr": Format(
        make=lambda f: write_exr(f / "a.exr", exr_channels(PICTURE.astype(np.float32))),
        damaged="a.exr",
        read=lambda f: read_exr_plane(f / "a.exr"),
    ),
    "hdr": Format(make=lambda f: _hdr(f / "a.hdr"), damaged="a.hdr", read=lambda f: read_radiance(f / "a.hdr")),
    "video": Format(
        make=lambda f: _video(f / "a.mp4"),
        damaged="a.mp4",
        read=lambda f: (frame_times(f / "a.mp4"), list(read_video(f / "a.mp4"))),
    ),
    "zarr": Format(make=_clip, damaged="a.clip/**/*", read=_read_clip),
    "kitti": Format(make=make_drive, damaged="**/*.*", read=_read_drive),
    "frames": Format(make=_frames, damaged="**/*.*", read=_read_frames),
    "pickle": Format(
        make=lambda f: (f / "a.pkl").write_bytes(pickle.dumps({"a": [1, 2.5, "x"], "b": np.arange(6.0)})),
        damaged="a.pkl",
        read=lambda f: read_plain_pickle(f / "a.pkl"),
    ),
    "lights": Format(
        make=lambda f: _json(f / "a.json", [LAMP]), damaged="a.json", read=lambda f: read_lights(f / "a.json")
    ),
    "features": Format(
        make=lambda f: features.write(f / "a.npz", _ARRAYS),
        damaged="a.npz",
        read=lambda f: features.fvd_of(f / "a.npz"),
    ),
    "boxes": Format(
        make=lambda f: _json(f / "a.json", [TestOVMono3D().result()]),
        damaged="a.json",
        read=lambda f: read_ovmono3d(f / "a.json", {2: "car"}),
    ),
    "nuscenes boxes": Format(
        make=lambda f: _json(f / "a.json", _NUSCENES),
        damaged="a.json",
        read=lambda f: read_nuscenes(f / "a.json", _POSES),
    ),
    "kitti boxes": Format(
        make=lambda f: ((f / "a.txt").write_text(LABEL.format(frame=0)), (f / "c.txt").write_text(CAM_TO_CAM)),
        damaged="*.txt",
        read=lambda f: read_kitti_tracking(f / "a.txt", read_projection(f / "c.txt")),
    ),
}


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes cut off, turned over, zeroed, written twice, taken out, replaced by large numbers, nested without end."""
    changed = bytearray(data)
    at = int(rng.integers(0, max(len(changed), 1)))
    length = int(rng.integers(1, 1 + max(min(64, len(changed) - at), 1)))
    match int(rng.integers(0, 8)):
        case 0:
            del changed[at:]
        case 1:
            for place in rng.integers(0, max(len(changed), 1), 1 + int(rng.integers(0, 4))):
                changed[place : place + 1] = bytes(
                    b ^ (1 << int(rng.integers(0, 8))) for b in changed[place : place + 1]
                )
        case 2:
            changed[at : at + length] = bytes(length)
        case 3:
            changed[at:at] = changed[at : at + length]
        case 4:
            del changed[at : at + length]
        case 5:
            changed[at : at + 4] = b"\xff\xff\xff\x7f"
        case 6:
            changed[at : at + length] = rng.bytes(length)
        case 7:
            changed[at:at] = b"[" * 20_000  # deeper than a parser follows
    return bytes(changed)


def main(name: str, first: str, end: str, root: str) -> None:
    """Read the damages first to end - 1; print the number of each before it is read."""
    form, folder = FORMATS[name], Path(root)
    form.make(folder)
    files = sorted(path for path in folder.glob(form.damaged) if path.is_file())
    whole = {path: path.read_bytes() for path in files}
    form.read(folder)  # undamaged it must be read
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    for number in range(int(first), int(end)):
        rng = np.random.default_rng([number, len(files)])
        path = files[int(rng.integers(0, len(files)))]
        print(number, path.name, flush=True)
        path.write_bytes(damaged(whole[path], rng))
        try:
            form.read(folder)
        except (InputError, MetricError) as error:
            if not str(error):
                raise SystemExit("an error without a word") from error
        except BaseException:
            traceback.print_exc()
            raise SystemExit(1) from None
        path.write_bytes(whole[path])


if __name__ == "__main__":
    main(*sys.argv[1:])
