"""DOVER (Wu et al., ICCV 2023): one quality of a video from the scores of its technical and its aesthetic branch."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from eval.errors import MetricError
from eval.score import Score
from eval.text_files import entry, read_json, read_table
from eval.values import Value, interval, mean

Array = NDArray[np.float64]

COLUMNS = ("technical", "aesthetic")
TECHNICAL_MEAN, TECHNICAL_SPREAD = 0.1107, 0.07355
AESTHETIC_MEAN, AESTHETIC_SPREAD = -0.08285, 0.03774


class Branches(NamedTuple):
    """What the two heads say of a video, not rescaled: about 0.11 +- 0.07 and -0.08 +- 0.04."""

    technical: float
    aesthetic: float


def paper_fusion(technical: ArrayLike, aesthetic: ArrayLike) -> Array:
    """0.572 T + 0.428 A of the branches as they are given (the paper's supplement; Wu et al. 2023).

    >>> float(paper_fusion(1.0, 0.0))
    0.572
    """
    return np.asarray(0.572 * np.asarray(technical) + 0.428 * np.asarray(aesthetic), dtype=np.float64)


def released_fusion(technical: ArrayLike, aesthetic: ArrayLike) -> Array:
    """sigmoid(0.6104 T' + 0.3896 A'), 0 to 1, as the released code has it.

    T' = (T - 0.1107) / 0.07355 and A' = (A + 0.08285) / 0.03774 are about 0 with a spread of 1 over LSVQ.

    >>> float(released_fusion(0.1107, -0.08285))
    0.5
    """
    t, a = _standardised(technical, aesthetic)
    return np.asarray(expit(0.6104 * t + 0.3896 * a), dtype=np.float64)


def rescaled(technical: ArrayLike, aesthetic: ArrayLike) -> tuple[Array, Array]:
    """sigmoid(T') and sigmoid(A'), 0 to 1: the branches as the released code prints them, one by one.

    >>> [float(branch) for branch in rescaled(0.1107, -0.08285)]
    [0.5, 0.5]
    """
    t, a = _standardised(technical, aesthetic)
    return expit(t), expit(a)


def _standardised(technical: ArrayLike, aesthetic: ArrayLike) -> tuple[Array, Array]:
    return (
        (np.asarray(technical, dtype=np.float64) - TECHNICAL_MEAN) / TECHNICAL_SPREAD,
        (np.asarray(aesthetic, dtype=np.float64) - AESTHETIC_MEAN) / AESTHETIC_SPREAD,
    )


@dataclass(frozen=True)
class Dover:
    """Mean over videos of the fused score.

    What moves the number: the fusion; and which branch is which: a published script swaps them, so branches are told
    apart by name alone. The paper's formula does not say whether the branches are rescaled first; the values it
    reports, 0.19 to 0.45, are those of rescaled ones, so `Score.others` has its fusion of these as well.
    """

    fusion: Literal["paper", "released"] = "paper"

    def score(self, videos: Sequence[Branches]) -> Score:
        """`frames` has the fused score of each video; `others` the other fusion and the branches.

        Raises
        ------
        MetricError
            There is no video.
        """
        if not videos:
            raise MetricError("scores: expected at least one video, got none")
        scores = [self._of(video) for video in videos]
        values = tuple(score.value for score in scores)
        others = {name: mean([score.others[name] for score in scores]) for name in scores[0].others}
        return Score(value=mean(values), frames=values, interval=interval(values), others=others)

    def by_video(self, videos: Mapping[str, Branches]) -> dict[str, Score]:
        """Score of each video, by its name; `others` as in `score`.

        >>> Dover().by_video({"fog.mp4": Branches(technical=1.0, aesthetic=0.0)})["fog.mp4"].value
        0.572
        """
        return {name: self._of(branches) for name, branches in videos.items()}

    def _of(self, video: Branches) -> Score:
        fused = {"paper": float(paper_fusion(*video)), "released": float(released_fusion(*video))}
        others: dict[str, Value] = {
            **{f"{name} fusion": value for name, value in fused.items()},
            "paper fusion of rescaled branches": float(paper_fusion(*rescaled(*video))),
            "technical": video.technical,
            "aesthetic": video.aesthetic,
        }
        return Score(value=fused[self.fusion], others=others)


PRESETS = {"paper": Dover("paper"), "released": Dover("released")}


def read_scores(path: Path) -> dict[str, Branches]:
    """Scores by video, from a file that names its columns.

    CSV: columns `technical`, `aesthetic` and, if there, `video`. JSON: {video: {"technical": …, "aesthetic": …}}, or a
    list of objects with technical, aesthetic and, if there, video. A video without a name has its number. Values are
    the raw outputs of the heads.

    Raises
    ------
    MetricError
        The file is not one of these, its columns have no names, a video comes twice, or a score is not finite.
    """
    return _from_json(path) if path.suffix.lower() == ".json" else _from_csv(path)


def _from_csv(path: Path) -> dict[str, Branches]:
    return _unique(path, read_table(path, required=COLUMNS, optional=("video",)))


def _from_json(path: Path) -> dict[str, Branches]:
    content = read_json(path)
    if isinstance(content, dict):
        with entry(path, "scores", "an object with technical and aesthetic for each video"):
            content = [{**scores, "video": video} for video, scores in content.items()]
    if not isinstance(content, list) or not content:
        raise MetricError(f"{path}: expected scores of videos by name, or a list of them, got {content!r:.80}")
    return _unique(path, {f"entry {number}": item for number, item in enumerate(content)})


def _unique(path: Path, items: Mapping[str, Mapping[str, Any]]) -> dict[str, Branches]:
    scores: dict[str, Branches] = {}
    for number, (place, item) in enumerate(items.items()):
        with entry(path, place, "technical and aesthetic, each by its name"):
            branches = Branches(*(float(item[name]) for name in COLUMNS))
            video = str(item.get("video", number))
            if not all(math.isfinite(value) for value in branches):
                raise MetricError(f"expected finite scores, got {branches.technical} and {branches.aesthetic}")
            if video in scores:
                raise MetricError(f"expected each video once, got {video} again")
            scores[video] = branches
    return scores
