"""Identity: is a vehicle after the edit still the one that it was? CLIP features of the same box before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eval.cosine import cosines
from eval.errors import MetricError
from eval.score import Score
from eval.values import Undefined, Value, defined, mean

Picture = NDArray[np.uint8]
Boxes = Sequence[Sequence[float]]
Encoder = Callable[[Sequence[Picture]], NDArray[Any]]  # pictures -> features (N, d), or of their patches (N, P, d)


@dataclass(frozen=True, kw_only=True)
class Identity:
    """Which part of the picture is compared, and how the boxes are averaged. Each choice moves the number.

    Parameters
    ----------
    features
        "patch": the cosine of each of CLIP's patches with the patch at the same place, mean over the crop; "crop": one
        cosine of the whole crop's embeddings.
    padding
        What is added around the box on every side, as a share of that side's length.
    square
        Whether the shorter side is widened to a square around the box; if not, the crop's sides are squashed to CLIP's
        square, as they are where the picture's border cuts a square.
    min_side
        Boxes that show less than this of their shorter side are undefined [px].
    mean_per
        "box": all boxes weigh the same; "frame": all frames that have a box do.
    """

    features: Literal["patch", "crop"] = "patch"
    padding: float = 0.1
    square: bool = False
    min_side: float = 32.0
    mean_per: Literal["box", "frame"] = "box"

    def crop(self, picture: Picture, box: Sequence[float]) -> Picture | Undefined:
        """What a box (left, top, right, bottom) [px] shows of a picture (H, W, 3), with its padding.

        Pixel centres are at integer coordinates; the crop ends at the picture's border.

        Raises
        ------
        MetricError
            The box is not four finite numbers, left < right and top < bottom.
        """
        low, high = _ends(box)
        end = np.array([picture.shape[1] - 1, picture.shape[0] - 1])
        shown = np.minimum(high, end) - np.maximum(low, 0)
        if shown.min() <= 0:
            return Undefined("box outside the picture")
        if shown.min() < self.min_side:
            return Undefined(f"box under {self.min_side:g} px")
        half = (high - low) / 2 * (1 + 2 * self.padding)
        if self.square:
            half[:] = half.max()
        first = np.maximum(np.rint((low + high) / 2 - half), 0).astype(int)
        last = np.minimum(np.rint((low + high) / 2 + half), end).astype(int)
        return picture[first[1] : last[1] + 1, first[0] : last[0] + 1]

    def frame(self, ref: Picture, gen: Picture, boxes: Boxes, encode: Encoder) -> tuple[Value, ...]:
        """Similarity of each box of one frame; `encode` gives the features named by `features`.

        Raises
        ------
        MetricError
            The two pictures have different sizes, or a box is none.
        """
        if ref.shape != gen.shape:
            raise MetricError(f"pictures: expected two of one size, got {ref.shape} and {gen.shape}")
        pairs = [(self.crop(ref, box), self.crop(gen, box)) for box in boxes]
        crops = [part for pair in pairs for part in pair if not isinstance(part, Undefined)]
        features = encode(crops) if crops else np.empty((0, 1))
        similar = iter(similarities(features[0::2], features[1::2]))
        return tuple(part if isinstance(part, Undefined) else next(similar) for part, _ in pairs)

    def pool(self, records: Sequence[Sequence[Value]]) -> Score:
        """The score of a video from its frames' boxes; `frames` lists what is averaged, boxes or frames."""
        boxes = tuple(chain.from_iterable(records))
        frames = tuple(mean(record) if defined(record) else Undefined("no box in the frame") for record in records)
        parts, other, name = (
            (boxes, frames, "mean of frames") if self.mean_per == "box" else (frames, boxes, "mean of boxes")
        )
        value = mean(parts) if defined(boxes) else Undefined("no box to compare")
        counts = {"boxes": float(len(boxes)), "boxes undefined": float(len(boxes) - len(defined(boxes)))}
        return Score(value=value, frames=parts, others={name: mean(other), **counts})


PRESETS = {"paper": Identity(), "crop": Identity(features="crop")}


def similarities(ref: NDArray[Any], gen: NDArray[Any]) -> tuple[Value, ...]:
    """Cosine of each crop's features before and after: (N, d), or (N, P, d), of which the P patches are averaged.

    >>> similarities(np.array([[[1.0, 0.0], [1.0, 0.0]]]), np.array([[[2.0, 0.0], [0.0, 2.0]]]))
    (0.5,)

    Raises
    ------
    MetricError
        Different shapes, or numbers that are not finite.
    """
    if ref.shape != gen.shape or ref.ndim not in (2, 3):
        raise MetricError(f"features: expected two of (N, d) or (N, P, d), got {ref.shape} and {gen.shape}")
    if ref.ndim == 2:
        return cosines(ref, gen)
    return tuple(mean(cosines(before, after)) for before, after in zip(ref, gen, strict=True))


def by_frame(values: Sequence[Value], frame: NDArray[Any]) -> list[list[Value]]:
    """Values of boxes, gathered by the number of their frame, in the order of the numbers; other frames have no box.

    >>> by_frame([0.25, 0.5, 0.75], np.array([7, 2, 7]))
    [[0.5], [0.25, 0.75]]
    """
    frames: dict[int, list[Value]] = {int(number): [] for number in np.unique(frame)}
    for value, number in zip(values, frame, strict=True):
        frames[int(number)].append(value)
    return list(frames.values())


def _ends(box: Sequence[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    corners = np.asarray(box, dtype=np.float64)
    if corners.shape != (4,) or not np.isfinite(corners).all() or not (corners[:2] < corners[2:]).all():
        raise MetricError(f"box: expected (left, top, right, bottom), left < right and top < bottom, got {list(box)}")
    return corners[:2], corners[2:]
