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
        By video, or by set for metrics of whole sets.
    seconds
        How long it took, decoding included where frames were decoded for it alone.
    weights
        File and SHA-256 of the model's weights, where it has any.
    """

    metric: str
    unit: str
    better: str
    convention: str
    settings: Mapping[str, Any]
    scores: Mapping[str, Score]
    seconds: float
    weights: Mapping[str, str] = field(default_factory=dict)

    @property
    def value(self) -> Value:
        """Mean over the videos."""
        return mean([score.value for score in self.scores.values()])

    @property
    def interval(self) -> tuple[float, float] | None:
        """Its 95 % interval: over videos where there are several, else the video's own, else over its frames."""
        scores = list(self.scores.values())
        if len(scores) > 1:
            return interval([score.value for score in scores])
        return scores[0].interval or interval(scores[0].frames)

    @property
    def undefined(self) -> dict[str, int]:
        """How many frames, and videos, have no value, by reason."""
        return undefined([value for score in self.scores.values() for value in (score.value, *score.frames)])

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
            "interval": None if ends is None else list(ends),
            "videos_n": len(self.scores),
            "frames_n": sum(len(score.frames) for score in self.scores.values()),
            "undefined": self.undefined,
            "weights": dict(self.weights),
            "seconds": round(self.seconds, 3),
            "videos": {name: _score(score) for name, score in self.scores.items()},
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


def _score(score: Score) -> dict[str, Any]:
    return {
        **_number("value", score.value),
        "interval": None if score.interval is None else list(score.interval),
        "frames": [plain(value) for value in score.frames],
        "undefined": undefined(score.frames),
        "others": {name: plain(value) for name, value in score.others.items()},
    }


def versions() -> dict[str, str]:
    """What computed the numbers: this project, Python, and the libraries that are installed."""
    found = {"aw4d": aw4d.__version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def to_json(results: Sequence[Result], skipped: Mapping[str, str], labels: Mapping[str, str]) -> dict[str, Any]:
    """Everything of one run; labels stand at the top."""
    return {
        **labels,
        "versions": versions(),
        "results": [result.to_json() for result in results],
        "skipped": dict(skipped),
    }


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write strict JSON: no NaN, no infinity."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _rows(results: Sequence[Result]) -> Iterator[tuple[object, ...]]:
    for result in results:
        for name, score in result.scores.items():
            for index, value in enumerate(score.frames):
                yield result.metric, result.convention, name, index, plain(value), reason(value)
            yield result.metric, result.convention, name, "", plain(score.value), reason(score.value)
        yield result.metric, result.convention, "", "", plain(result.value), reason(result.value)


def write_csv(path: Path, results: Sequence[Result]) -> None:
    """Write a row a frame, a row a video (no frame) and a row for the mean (no video)."""
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("metric", "convention", "video", "frame", "value", "reason"))
        writer.writerows(_rows(results))
