"""FVD: Frechet distance of two sets of videos on features of I3D. Unterthiner et al. 2019."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.frechet import Statistics, check, distance
from eval.score import Score
from eval.values import Undefined, Value

MIN_FRAMES = 10  # fewer do not survive I3D's strides in time
SIDE = 224  # of the square pictures that I3D takes


@dataclass(frozen=True, kw_only=True)
class Fvd:
    """What of a video I3D sees: one clip of each video, from its first frame on. Each choice moves the number.

    Parameters
    ----------
    frames
        Frames of a clip, at least 10; None: all that the video has.
    stride
        1: every frame is taken, 2: every second one.
    resize
        Who makes the frame a square of 224 pixels, its sides squashed: "inside", I3D itself (bilinear, without
        antialiasing: what most published numbers are; 57 frames of 1280x704 take 0.6 GB), or "area", averages of what
        each pixel covers.
    """

    frames: int | None = None
    stride: int = 1
    resize: Literal["inside", "area"] = "inside"

    def __post_init__(self) -> None:
        if self.frames is not None and self.frames < MIN_FRAMES:
            raise MetricError(f"frames: expected at least {MIN_FRAMES} for I3D, got {self.frames}")
        if self.stride < 1:
            raise MetricError(f"stride: expected at least 1, got {self.stride}")

    def clip(self, video: Iterable[NDArray[np.uint8]], name: str = "video") -> NDArray[np.uint8]:
        """The frames of a video (H, W, 3) that I3D is given, (T, H, W, 3) or (T, 224, 224, 3).

        Raises
        ------
        MetricError
            The video has too few frames.
        """
        stop = None if self.frames is None else (self.frames - 1) * self.stride + 1
        taken = [self._sized(frame) for frame in islice(video, 0, stop, self.stride)]
        wanted = self.frames or MIN_FRAMES
        if len(taken) < wanted:
            raise MetricError(f"{name}: expected at least {wanted} frames at stride {self.stride}, got {len(taken)}")
        return np.stack(taken)

    def _sized(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self.resize == "inside":
            return frame
        return np.asarray(cv2.resize(frame, (SIDE, SIDE), interpolation=cv2.INTER_AREA), dtype=np.uint8)


PRESETS = {"paper": Fvd(), "16-frames": Fvd(frames=16)}


def fvd(ref: NDArray[Any] | Statistics, gen: NDArray[Any] | Statistics, *, seed: int = 0) -> Score:
    """Frechet distance of two sets of videos: features of I3D (N, d) and (M, d), one a video, or their statistics.

    With fewer videos than numbers in a feature the distance has a floor far above 0: 120 samples of a normal
    distribution of 400 unit variances are about 450 from 120 others of the same. So the score carries, in `others`,
    how many videos there were, their number over d, and the distance of two random halves of `ref`, which is a
    floor too (and, of half the videos, a higher one).

    >>> fvd(np.zeros((8, 3)), np.ones((8, 3))).value
    3.0

    Raises
    ------
    MetricError
        Features that are no finite table, or of two different lengths.
    """
    counts = [of.count if isinstance(of, Statistics) else len(of) for of in (ref, gen)]
    if min(counts) < 2:
        return Score(value=Undefined("a set has fewer than 2 videos"), others=_counted(counts))
    value = distance(ref, gen)
    d = ref.mean.size if isinstance(ref, Statistics) else ref.shape[1]
    others = {"videos over d": min(counts) / d, "same-set split": same_set_split(ref, seed=seed)}
    return Score(value=value, others={**_counted(counts), **others})


def same_set_split(features: NDArray[Any] | Statistics, *, seed: int = 0) -> Value:
    """Distance of two random halves of one set: how far from 0 the distance of equals is at half its size."""
    if isinstance(features, Statistics):
        return Undefined("only statistics are kept")
    table = check(features)
    half = len(table) // 2
    if half < 2:
        return Undefined("fewer than 4 videos to halve")
    order = np.random.default_rng(seed).permutation(len(table))
    return distance(table[order[:half]], table[order[half : 2 * half]])


def _counted(counts: list[int]) -> dict[str, Value]:
    return {"videos of ref": float(counts[0]), "videos of gen": float(counts[1])}
