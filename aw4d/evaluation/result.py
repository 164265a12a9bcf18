"""What an evaluation found of one metric over all videos, as plain JSON without NaN and as rows of a CSV."""

from __future__ import annotations

import csv
import importlib.metadata
import json
import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import aw4d
from aw4d.io.files import replacing
from eval.score import Score
from eval.values import Undefined, Value, interval, mean, undefined

LIBRARIES = ("numpy", "scipy", "scikit-image", "opencv-python-headless", "av", "torch", "open_clip_torch")
EQUAL = "infinite: the two are equal"


@dataclass(frozen=True, kw_only=True)
class Result:
    """One metric of some videos.

    Parameters
    ----------
    metric, unit, better
        Name; unit, "1" for none; "higher", "lower" or "neither".
    convention
        Name of the definition that was used.
    settings
        Its parameters.
    scores
        By video, by set for metrics of whole sets, by method for answers.
    whole
        Of all videos as one, where that is no mean.
    averaged
        Whether the mean over `scores` says anything: of methods it does not.
    numbers
        Numbers of the frames that a video's score has, where it has frames.
    seconds
        How long it took, together with the metrics that were computed from the same reading.
    weights
        The model: file, SHA-256 and what else decides its numbers.
    """

    metric: str
    unit: str
    better: str
    convention: str
    settings: Mapping[str, Any]
    scores: Mapping[str, Score]
    seconds: float
    whole: Score | None = None
    averaged: bool = True
    numbers: Mapping[str, Sequence[int]] = field(default_factory=dict)
    weights: Mapping[str, str] = field(default_factory=dict)

    @property
    def value(self) -> Value:
        """That of the only video; of all as one, or their mean."""
        if len(self.scores) == 1:
            return next(iter(self.scores.values())).value
        if self.whole is not None:
            return self.whole.value
        if not self.averaged:
            return Undefined("no mean over methods")
        return mean([score.value for score in self.scores.values()])

    @property
    def interval(self) -> tuple[float, float] | None:
        """Its 95 % interval, that of the mean over videos where it is one."""
        if len(self.scores) == 1:
            return next(iter(self.scores.values())).interval
        if self.whole is not None or not self.averaged:
            return None if self.whole is None else self.whole.interval
        return interval([score.value for score in self.scores.values()])

    @property
    def undefined(self) -> dict[str, int]:
        """How many frames have no value, by reason; of videos without frames, how many of these."""
        parts = (score.frames or (score.value,) for score in self.scores.values())
        return undefined([value for values in parts for value in values])

    def frame_numbers(self, name: str) -> Sequence[int]:
        """Numbers of the frames of a video's score; counted from 0 where its parts are no frames."""
        frames, numbers = self.scores[name].frames, self.numbers.get(name, ())
        return numbers if len(numbers) == len(frames) else range(len(frames))

    def to_json(self) -> dict[str, Any]:
        """The result as plain numbers, strings and lists; what has no value is null, with its reason."""
        ends = self.interval
        return {
            "metric": self.metric,
            "convention": self.convention,
            "settings": dict(self.settings),
            "unit": self.unit,
            "better": self.better,
            **_number("value", self.value),
            "mean": self.averaged,
            "interval": None if ends is None else list(ends),
            "videos_n": len(self.scores),
            "frames_n": sum(len(score.frames) for score in self.scores.values()),
            "undefined": self.undefined,
            "weights": dict(self.weights),
            "seconds": round(self.seconds, 3),
            "others": {} if self.whole is None else _others(self.whole),
            "videos": {name: self._score(name) for name in self.scores},
        }

    def _score(self, name: str) -> dict[str, Any]:
        score = self.scores[name]
        return {
            **_number("value", score.value),
            "interval": None if score.interval is None else list(score.interval),
            "frame_numbers": list(self.frame_numbers(name)),
            "frames": [plain(value) for value in score.frames],
            "undefined": undefined(score.frames),
            "others": _others(score),
            "others_undefined": {key: reason(value) for key, value in score.others.items() if reason(value)},
        }


def plain(value: Value) -> float | None:
    """The value as a number that JSON can hold."""
    return None if isinstance(value, Undefined) or not math.isfinite(value) else float(value)


def reason(value: Value) -> str | None:
    """Why a value is not a finite number."""
    if isinstance(value, Undefined):
        return value.reason
    return None if math.isfinite(value) else EQUAL


def _number(name: str, value: Value) -> dict[str, Any]:
    return {name: plain(value)} if reason(value) is None else {name: None, "reason": reason(value)}


def _others(score: Score) -> dict[str, float | None]:
    return {name: plain(value) for name, value in score.others.items()}


def versions() -> dict[str, str]:
    """What computed the numbers: this project, Python, and the libraries that are installed."""
    found = {"aw4d": aw4d.__version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def to_json(
    results: Sequence[Result],
    skipped: Mapping[str, str],
    failed: Mapping[str, str] | None = None,
    given: Mapping[str, Any] | None = None,
    labels: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Everything of one run; labels stand at the top."""
    return {
        **(labels or {}),
        "versions": versions(),
        "inputs": dict(given or {}),
        "results": [result.to_json() for result in results],
        "skipped": dict(skipped),
        "failed": dict(failed or {}),
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write strict JSON: no NaN, no infinity."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _rows(results: Sequence[Result]) -> Iterator[tuple[object, ...]]:
    for result in results:
        for name, score in result.scores.items():
            for number, value in zip(result.frame_numbers(name), score.frames, strict=True):
                yield result.metric, result.convention, name, number, plain(value), reason(value)
            yield result.metric, result.convention, name, "", plain(score.value), reason(score.value)
        yield result.metric, result.convention, "", "", plain(result.value), reason(result.value)


def write_csv(path: Path, results: Sequence[Result]) -> None:
    """Write a row a frame, a row a video (no frame) and a row for the mean (no video)."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("metric", "convention", "video", "frame", "value", "reason"))
        writer.writerows(_rows(results))
