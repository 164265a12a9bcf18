"""Which video is measured against which, and frame against which frame: told, never guessed."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.clip import indices
from aw4d.errors import InputError
from aw4d.evaluation.depths import is_depth, open_depth
from aw4d.evaluation.videos import Video, is_video, open_video, stem
from aw4d.io.files import read_text

LARGEST = 16384  # [px] side that frames are brought to
SAME_RATE = 0.01  # rates closer than this are one: 29.97 and 30, and times rounded to milliseconds


@dataclass(frozen=True, kw_only=True)
class Selection:
    """How videos that differ are brought together, as the command line has it; None: they must not differ.

    Parameters
    ----------
    frames
        `A:B`, frames of both sides, counted after `stride`.
    stride
        `N`, every N-th frame of both sides, or `R:G`, every R-th of ref against every G-th of gen. Pairs frames by
        number, whatever their rates.
    resize
        `WxH`, size that both sides are brought to [px]: pictures by the mean over areas, depths by the nearest pixel,
        since the mean over an edge is the depth of nothing.
    """

    frames: str | None = None
    stride: str | None = None
    resize: str | None = None

    def range_of(self, count: int, *, side: str) -> range:
        """Frames that are taken of so many.

        Parameters
        ----------
        side
            "ref" or "gen": of which a stride `R:G` is meant.

        Raises
        ------
        InputError
            `frames` or `stride` cannot be read or met.
        """
        return _chosen(range(0, count, _strides(self.stride)[side == "gen"]), self.frames)


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two videos, frame by frame; iterating reads both sides once, in order.

    Parameters
    ----------
    name
        Name of the generated video.
    ref, gen
        The videos.
    ref_frames, gen_frames
        Frames that are paired, of one length.
    size
        Height and width [px] of what is given out.
    """

    name: str
    ref: Video
    gen: Video
    ref_frames: range
    gen_frames: range
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.ref_frames)

    def __iter__(self) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        sides = (self.ref.frames(self.ref_frames), self.gen.frames(self.gen_frames))
        for ref, gen in zip(*sides, strict=True):
            yield _resized(ref, self.size), _resized(gen, self.size)


@dataclass(frozen=True, kw_only=True)
class Taken:
    """One video by itself, as far as a selection takes it; iterating reads it once, in order."""

    name: str
    video: Video
    chosen: range
    size: tuple[int, int]

    def __len__(self) -> int:
        return len(self.chosen)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return (_resized(frame, self.size) for frame in self.video.frames(self.chosen))


def _resized(frame: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    if frame.shape[:2] == size:
        return frame
    how = cv2.INTER_AREA if frame.dtype == np.uint8 else cv2.INTER_NEAREST_EXACT
    return np.asarray(cv2.resize(frame, size[::-1], interpolation=how))


class Kind(NamedTuple):
    """What is paired, and the forms in which it comes."""

    name: str
    forms: str
    is_one: Callable[[Path], bool]
    open: Callable[[Path], Video]


_VIDEO = Kind("video", "a video file, a folder of PNG or JPEG pictures or a clip", is_video, open_video)
_DEPTH = Kind("depth", "a folder of .npy, .exr or .png files, an .npz or a clip", is_depth, open_depth)


def video_pairs(ref: Path, gen: Path, selection: Selection, csv_file: Path | None = None) -> list[Pair]:
    """Pairs of pictures: two videos, or two folders of videos that are paired by stem or by a CSV.

    Parameters
    ----------
    ref, gen
        Each a video file, a folder of pictures or a clip; or each a folder of such.
    selection
        How videos that differ in length, rate or size are brought together.
    csv_file
        Columns `ref` and `gen`: paths, from the folders `ref` and `gen`; a reference may occur many times.

    Raises
    ------
    InputError
        A video has no partner or cannot be read, or two differ and the selection does not say what to do.
    """
    return pairs(_VIDEO, ref, gen, selection, csv_file)


def depth_pairs(ref: Path, gen: Path, selection: Selection, csv_file: Path | None = None) -> list[Pair]:
    """Pairs of depth maps, as `video_pairs`; each side a folder of maps, an .npz or a clip, or a folder of such."""
    return pairs(_DEPTH, ref, gen, selection, csv_file)


def pairs(kind: Kind, ref: Path, gen: Path, selection: Selection, csv_file: Path | None) -> list[Pair]:
    """Pairs of any kind, as `video_pairs`."""
    found = _matched(kind, ref, gen) if csv_file is None else _from_csv(kind, csv_file, ref, gen)
    names = _names([other for _, other in found])
    return [
        pair(kind.open(one), kind.open(other), selection, name) for (one, other), name in zip(found, names, strict=True)
    ]


def _names(paths: Sequence[Path]) -> list[str]:
    """Stems, and of those that are not unique the whole paths."""
    count = Counter(stem(path) for path in paths)
    return [stem(path) if count[stem(path)] == 1 else path.as_posix() for path in paths]


def videos_of(path: Path, selection: Selection, *, side: str) -> list[Taken]:
    """The video, or the videos of a folder by stem, as far as the selection takes them.

    Parameters
    ----------
    side
        "ref" or "gen": of which a stride `R:G` is meant.

    Raises
    ------
    InputError
        There is none, or one cannot be read.
    """
    paths = [path] if is_video(path) else list(_by_stem(_VIDEO, path).values())
    taken = []
    for name, video in zip(_names(paths), map(open_video, paths), strict=True):
        size = (video.height, video.width) if selection.resize is None else _size(selection.resize)
        chosen = selection.range_of(video.count, side=side)
        taken.append(Taken(name=name, video=video, chosen=chosen, size=size))
    return taken


def _matched(kind: Kind, ref: Path, gen: Path) -> list[tuple[Path, Path]]:
    if kind.is_one(ref) and kind.is_one(gen):
        return [(ref, gen)]
    if kind.is_one(ref):  # one recording, edited several times
        return [(ref, one) for one in _by_stem(kind, gen).values()]
    if kind.is_one(gen):
        raise InputError(f"{ref}: expected one {kind.name}, as {gen} is, got {_what_is_there(ref)}")
    refs, gens = _by_stem(kind, ref), _by_stem(kind, gen)
    alone = [*(refs[name] for name in refs.keys() - gens.keys()), *(gens[name] for name in gens.keys() - refs.keys())]
    if alone:
        names = ", ".join(sorted(map(str, alone)))
        raise InputError(f"expected a {kind.name} of the same stem on the other side, got none for {names}")
    return [(refs[name], gens[name]) for name in sorted(refs)]


def _by_stem(kind: Kind, folder: Path) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name.startswith(".") or not kind.is_one(path):
            continue
        if stem(path) in found:
            raise InputError(f"{folder}: expected one {kind.name} of a stem, got {found[stem(path)].name}, {path.name}")
        found[stem(path)] = path
    if not found:
        raise InputError(f"{folder}: expected {kind.forms}, or a folder of such, got {_what_is_there(folder)}")
    return found


def _what_is_there(path: Path) -> str:
    if path.is_dir():
        return "another kind of folder"
    return "another kind of file" if path.exists() else "nothing"


def _from_csv(kind: Kind, file: Path, ref: Path, gen: Path) -> list[tuple[Path, Path]]:
    rows = csv.DictReader(read_text(file).splitlines())
    columns = rows.fieldnames or []
    if not {"ref", "gen"} <= set(columns):
        raise InputError(f"{file}: expected columns ref and gen, got {', '.join(columns)}")
    found: dict[Path, Path] = {}
    for row in rows:
        line = f"{file}: line {rows.line_num}"
        if not row["ref"] or not row["gen"]:
            raise InputError(
                f"{line}: expected a ref and a gen, got {row['ref'] or 'nothing'}, {row['gen'] or 'nothing'}"
            )
        one, other = ref / row["ref"], gen / row["gen"]
        for path in (one, other):
            if not kind.is_one(path):
                raise InputError(f"{line}: {path}: expected {kind.forms}, got {_what_is_there(path)}")
        if other in found:
            raise InputError(f"{line}: expected every gen once, got {other} again")
        found[other] = one
    if not found:
        raise InputError(f"{file}: expected a row below the names of the columns, got none")
    return [(one, other) for other, one in found.items()]


def pair(ref: Video, gen: Video, selection: Selection, name: str | None = None) -> Pair:
    """Two videos, frame against frame; called as the generated one, unless another name is given.

    Raises
    ------
    InputError
        They differ in rate, length or size, and the selection does not say what to do; or it cannot be read or met.
    """
    if selection.stride is None:
        _check_rate(ref, gen)
    ref_frames, gen_frames = selection.range_of(ref.count, side="ref"), selection.range_of(gen.count, side="gen")
    if len(ref_frames) != len(gen_frames):
        raise InputError(
            f"expected as many frames on both sides, got {len(ref_frames)} of {ref.path} and {len(gen_frames)} of "
            f"{gen.path}: --frames 0:{min(len(ref_frames), len(gen_frames))} takes what both have"
        )
    if selection.stride is None:
        _check_names(ref, gen, ref_frames, gen_frames)
    size = (ref.height, ref.width) if selection.resize is None else _size(selection.resize)
    if selection.resize is None and (gen.height, gen.width) != size:
        raise InputError(
            f"expected frames of one size, got {ref.width}x{ref.height} in {ref.path} and {gen.width}x{gen.height} in "
            f"{gen.path}: --resize {ref.width}x{ref.height} brings both to the first"
        )
    return Pair(name=name or gen.name, ref=ref, gen=gen, ref_frames=ref_frames, gen_frames=gen_frames, size=size)


def _check_rate(ref: Video, gen: Video) -> None:
    if ref.fps and gen.fps and abs(ref.fps / gen.fps - 1) > SAME_RATE:
        raise InputError(
            f"expected one frame rate, got {ref.fps:.4g} a second in {ref.path} and {gen.fps:.4g} in {gen.path}: "
            "--stride 1 pairs frames by number, --stride R:G every R-th of ref with every G-th of gen"
        )


def _check_names(ref: Video, gen: Video, ref_frames: range, gen_frames: range) -> None:
    """Of two folders of files, frames are paired by place: their numbers must agree."""
    if ref.names is None or gen.names is None:
        return
    for one, other in zip((ref.names[i] for i in ref_frames), (gen.names[i] for i in gen_frames), strict=True):
        if _number(one) != _number(other):
            raise InputError(
                f"expected frames of one number on both sides, got {one} in {ref.path} and {other} in {gen.path}: "
                "--stride 1 pairs them by place"
            )


def _number(name: str) -> int | None:
    """The last number in a name; None where there is none."""
    found = re.findall(r"\d+", name)
    return int(found[-1]) if found else None


def _chosen(frames: range, text: str | None) -> range:
    positions = indices(text, len(frames))
    return frames[positions.start : positions.stop]


def _strides(text: str | None) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d*)(?::([1-9]\d*))?", text or "1")
    if not found:
        raise InputError(f"--stride: expected N or R:G, whole numbers from 1, got {text!r}")
    return int(found[1]), int(found[2] or found[1])


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)
    if not found:
        raise InputError(f"--resize: expected WxH in pixels, as 1280x704, got {text!r}")
    if max(int(found[1]), int(found[2])) > LARGEST:
        raise InputError(f"--resize: expected at most {LARGEST} pixels a side, got {text}")
    return int(found[2]), int(found[1])
