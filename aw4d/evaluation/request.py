"""What the user gave to be measured, and what it lacks for a metric."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.pairs import Pair, Selection, Taken, video_pairs, videos_of
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
        Clip of the scene where `ref` is none: its depth, poses, boxes and cameras.
    camera
        JSON with K (or fx, fy, cx, cy), width and height, for boxes that belong to no clip; `extrinsic` for Waymo's.
    calib
        KITTI's calibration file with P2, for its labels.
    first_frame
        Number that files of boxes give to the first frame.
    categories
        JSON with the names of a detector's numbers of categories.
    min_score
        Boxes of a detector that are less sure are left out.
    ref_depth, gen_depth, ref_boxes, gen_boxes, ref_labels, gen_labels
        What others found in `ref` and `gen`.
    ref_disparity, gen_disparity
        Whether that side's depth is disparity.
    base, instruction, prompts
        What the scene shows; what the edit shall do; or both by video, a CSV with the columns gen, base, instruction.
    prompt_mode
        Which of them is compared: "base", "instruction" or "joined"; None: as the convention has it.
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
    first_frame: int = 0
    categories: Path | None = None
    min_score: float | None = None
    ref_depth: Path | None = None
    gen_depth: Path | None = None
    ref_boxes: Path | None = None
    gen_boxes: Path | None = None
    ref_labels: Path | None = None
    gen_labels: Path | None = None
    ref_disparity: bool = False
    gen_disparity: bool = False
    base: str | None = None
    instruction: str | None = None
    prompts: Path | None = None
    prompt_mode: str | None = None
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
        """What belongs to `ref` and what to `gen`, of a kind: "depth", "boxes" or "labels"; "" for the videos.

        Raises
        ------
        MissingInputError
            One or both were not given.
        """
        names = [f"{side}_{kind}" if kind else side for side in ("ref", "gen")]
        missing = [f"--{name.replace('_', '-')}" for name in names if getattr(self, name) is None]
        if missing:
            raise MissingInputError(f"{' and '.join(missing)}: {what}")
        return getattr(self, names[0]), getattr(self, names[1])

    def videos(self) -> list[Pair]:
        """Videos in pairs.

        Raises
        ------
        MissingInputError
            A side is not given.
        """
        ref, gen = self.both("", "a video, a folder of pictures or a clip")
        return video_pairs(ref, gen, self.selection, self.pairs)

    def side(self, side: str) -> list[Taken]:
        """The videos of one side, by themselves.

        Raises
        ------
        MissingInputError
            The side is not given.
        """
        path = self.need(side, f"--{side}", "a video, a folder of pictures, a clip, or a folder of such")
        return videos_of(path, self.selection, side=side)

    def scene(self, pair: Pair | None = None) -> Clip:
        """The clip of the scene: the reference of the pair if that is a clip, else the one that was given.

        Raises
        ------
        MissingInputError
            There is none.
        """
        candidates = (pair.ref.path if pair else self.ref, self.clip)
        path = next((path for path in candidates if path is not None and is_clip(path)), self.clip)
        if path is None:
            raise MissingInputError("--clip: the clip of the scene, with its depth and poses")
        return Clip(path)

    def given(self) -> dict[str, Any]:
        """What was given, as JSON can hold it."""
        told = {held.name: getattr(self, held.name) for held in fields(self) if held.name != "selection"}
        told |= vars(self.selection)
        plain = {name: str(value) if isinstance(value, Path) else value for name, value in told.items()}
        return {name: value for name, value in plain.items() if value not in (None, False, 0)}

    def paths(self) -> list[Path]:
        """Everything that is read."""
        return [value for value in vars(self).values() if isinstance(value, Path)]


@dataclass(frozen=True, kw_only=True)
class Found:
    """What was found of one metric.

    Parameters
    ----------
    scores
        By video, set or method.
    whole
        Of all videos as one, where that is no mean.
    numbers
        Numbers of the frames that a video's score has, where it has frames.
    weights
        The model: file, SHA-256 and what else decides its numbers.
    convention
        In place of the preset's name, where that was not what counted.
    """

    scores: Mapping[str, Score]
    whole: Score | None = None
    numbers: Mapping[str, Sequence[int]] = field(default_factory=dict)
    weights: Mapping[str, str] = field(default_factory=dict)
    convention: str | None = None


Run = Callable[[Request, Mapping[str, Any], Watch], dict[str, Found]]  # conventions by metric to what was found
