"""What the user gave to be measured, and what it lacks for a metric."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.pairs import Pair, Selection, video_pairs
from aw4d.evaluation.videos import is_clip
from eval.score import Score

Watch = Callable[[Iterable[Any], str, int], Iterable[Any]]  # items on their way, what they are, how many


class MissingInputError(InputError):
    """A metric needs what was not given; `all` goes on without that metric."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Paths and texts by what they are; a metric takes those that it needs.

    Parameters
    ----------
    ref, gen
        Videos, before and after the edit: a file, a folder of pictures, a clip, or a folder of such.
    pairs
        CSV with the columns ref and gen, in place of pairing by stem.
    selection
        How videos that differ are brought together.
    clip
        Clip of the scene in `ref`: its depth, poses, boxes and cameras; `ref` itself, if that is a clip.
    camera
        JSON with K (or fx, fy, cx, cy), width and height, for boxes that belong to no clip; `extrinsic` for Waymo's.
    calib
        KITTI's calibration file with P2, for its labels.
    categories
        JSON with the names of a detector's numbers of categories.
    ref_depth, gen_depth, ref_boxes, gen_boxes, ref_labels, gen_labels
        What others found in `ref` and `gen`.
    base, instruction, prompts
        What the scene shows; what the edit shall do; or both by video, a CSV with the columns gen, base, instruction.
    clip_weights, clip_model, i3d_weights
        Models' files of weights, and open_clip's name of a model where the file does not say it.
    features
        .npz of features, in place of a model; see `eval.features`.
    scores, responses
        Files of DOVER's scores and of answers to two-alternative forced choices.
    """

    ref: Path | None = None
    gen: Path | None = None
    pairs: Path | None = None
    selection: Selection = field(default_factory=Selection)
    clip: Path | None = None
    camera: Path | None = None
    calib: Path | None = None
    categories: Path | None = None
    ref_depth: Path | None = None
    gen_depth: Path | None = None
    ref_boxes: Path | None = None
    gen_boxes: Path | None = None
    ref_labels: Path | None = None
    gen_labels: Path | None = None
    base: str | None = None
    instruction: str | None = None
    prompts: Path | None = None
    clip_weights: Path | None = None
    clip_model: str | None = None
    i3d_weights: Path | None = None
    features: Path | None = None
    scores: Path | None = None
    responses: Path | None = None

    def need(self, name: str, option: str, what: str) -> Path:
        """The path that was given under a name.

        Raises
        ------
        MissingInputError
            None was.
        """
        path: Path | None = getattr(self, name)
        if path is None:
            raise MissingInputError(f"{option}: {what}")
        return path

    def both(self, kind: str, what: str) -> tuple[Path, Path]:
        """What belongs to `ref` and what to `gen`, of a kind: "depth", "boxes" or "labels"."""
        ref, gen = (
            self.need(f"{side}_{kind}", f"--{side}-{kind}", f"{what} of {side}, a file or folder")
            for side in ("ref", "gen")
        )
        return ref, gen

    def videos(self) -> list[Pair]:
        """Videos in pairs.

        Raises
        ------
        MissingInputError
            A side is not given.
        """
        ref, gen = (self.need(side, f"--{side}", "a video, a folder of pictures or a clip") for side in ("ref", "gen"))
        return video_pairs(ref, gen, self.selection, self.pairs)

    def scene(self) -> Clip:
        """The clip of the scene.

        Raises
        ------
        MissingInputError
            There is none.
        """
        path = self.clip or (self.ref if self.ref is not None and is_clip(self.ref) else None)
        if path is None:
            raise MissingInputError("--clip: the clip of the scene, with its depth and poses")
        return Clip(path)


@dataclass(frozen=True, kw_only=True)
class Found:
    """Scores of one metric by video, and the file and SHA-256 of the weights that it took."""

    scores: Mapping[str, Score]
    weights: Mapping[str, str] = field(default_factory=dict)


Run = Callable[[Request, Mapping[str, Any], Watch], dict[str, Found]]  # conventions by metric to what was found
