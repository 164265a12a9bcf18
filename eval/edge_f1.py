"""Edge F1: how many edges of one video are edges of the other, pixel for pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.pictures import check_pair
from eval.score import Score
from eval.values import Undefined, Value, mean

NO_EDGES = Undefined("no edges in either picture")


class Counts(NamedTuple):
    """Pixels that are edges in both pictures, in the generated one alone, and in the reference alone."""

    true_positive: int
    false_positive: int
    false_negative: int


def edges(picture: NDArray[np.uint8], low: float, high: float) -> NDArray[np.bool_]:
    """Edge pixels, (H, W), of a picture, (H, W, 3) sRGB or (H, W) grey, uint8. Canny 1986 as OpenCV has it.

    Colour is made grey by the weights of BT.601 (.299, .587, .114), in codes; Sobel 3 x 3, |gx| + |gy|, no blur.

    Parameters
    ----------
    low, high
        Thresholds of the gradient [codes]: edges begin above `high` and go on above `low`.
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) if picture.ndim == 3 else picture
    return np.asarray(cv2.Canny(grey, low, high) > 0)


def counts(ref: NDArray[np.bool_], gen: NDArray[np.bool_]) -> Counts:
    """Pixels of two edge maps, (H, W), by kind.

    Examples
    --------
    >>> counts(np.array([[True, True, False]]), np.array([[True, False, True]]))
    Counts(true_positive=1, false_positive=1, false_negative=1)
    """
    both = int(np.count_nonzero(ref & gen))
    return Counts(both, int(np.count_nonzero(gen)) - both, int(np.count_nonzero(ref)) - both)


def f1(found: Counts) -> Value:
    """F1 = 2 TP / (2 TP + FP + FN), the harmonic mean of precision and recall, within [0, 1].

    Undefined where neither side has an edge. Where one side alone has edges none is found again: 0.

    Examples
    --------
    >>> f1(Counts(2, 1, 1)), f1(Counts(0, 0, 5))
    (0.6666666666666666, 0.0)
    >>> f1(Counts(0, 0, 0))
    Undefined(reason='no edges in either picture')
    """
    marked = 2 * found.true_positive + found.false_positive + found.false_negative
    return 2 * found.true_positive / marked if marked else NO_EDGES


def _share(part: int, whole: int, reason: str) -> Value:
    return part / whole if whole else Undefined(reason)


@dataclass(frozen=True, kw_only=True)
class EdgeF1:
    """Edge F1 of two videos: pixels counted over all frames, then one F1; no tolerance in place.

    What moves the number: the thresholds; pooling (the mean of the frames' F1 stands beside the value); Canny on the
    three channels in place of grey, as some tools do; a blur before; resizing, which moves edges by a pixel; H.264.
    pai-bench gives no score to a video that has no edges at all; here it is 0 if the other has some, else undefined.

    Parameters
    ----------
    low, high
        Canny's thresholds [codes].
    """

    low: float = 30.0
    high: float = 60.0

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> Counts:
        """Edge pixels of one pair of pictures, (H, W, 3) sRGB or (H, W) grey, uint8.

        Raises
        ------
        MetricError
            The pictures differ in shape, or are of another kind.
        """
        check_pair("edge-f1", ref, gen)
        if ref.dtype != np.uint8:
            raise MetricError(f"edge-f1: expected 8-bit codes, which Canny's thresholds are in, got {ref.dtype.name}")
        return counts(edges(ref, self.low, self.high), edges(gen, self.low, self.high))

    def pool(self, records: Sequence[Counts]) -> Score:
        """F1 of the sums over the frames."""
        total = Counts(*(sum(kind) for kind in zip(*records, strict=True))) if records else Counts(0, 0, 0)
        frames = tuple(f1(found) for found in records)
        in_gen = total.true_positive + total.false_positive
        in_ref = total.true_positive + total.false_negative
        others = {
            "precision": _share(total.true_positive, in_gen, "no edges in gen"),
            "recall": _share(total.true_positive, in_ref, "no edges in ref"),
            "mean of frames": mean(frames),
        }
        return Score(value=f1(total), frames=frames, others=others)

    def summands(self, records: Sequence[Counts]) -> NDArray[np.float64]:
        """Pixels by kind."""
        return np.array(records, dtype=np.float64)

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """F1 of all pixels."""
        return f1(Counts(*(int(pixels) for pixels in sums)))


PRESETS = {"paper": EdgeF1(low=30.0, high=60.0), "pai-bench": EdgeF1(low=100.0, high=200.0)}
