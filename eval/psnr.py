"""PSNR: the mean squared error of two videos against the largest value, in decibels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eval.pictures import check_pair
from eval.score import Score, mean_of_sums, summands_of_mean
from eval.values import Undefined, Value, mean


def mse(ref: NDArray[Any], gen: NDArray[Any]) -> float:
    """Mean squared error over all pixels and channels, in squared units of the pictures.

    Parameters
    ----------
    ref, gen
        (H, W) or (H, W, 3), both uint8 codes or both finite floats.

    Raises
    ------
    MetricError
        The pictures differ in shape or dtype, or are of another kind.

    Examples
    --------
    >>> import numpy as np
    >>> mse(np.zeros((2, 2)), np.array([[1.0, 0.0], [0.0, 1.0]]))
    0.5
    """
    check_pair("psnr", ref, gen)
    return float(cv2.norm(ref, gen, cv2.NORM_L2SQR)) / ref.size  # integers for uint8, else summed in double


def psnr(error: float, data_range: float = 255.0) -> float:
    """PSNR [dB] of a mean squared error: 10 log10(data_range^2 / error); infinite without an error.

    Parameters
    ----------
    error
        Mean squared error, >= 0.
    data_range
        Largest value less smallest that the pictures' type has: 255 for 8-bit codes.

    Examples
    --------
    >>> psnr(0.01, data_range=1.0)
    20.0
    >>> psnr(0.0)
    inf
    """
    return 10 * math.log10(data_range**2 / error) if error else math.inf


@dataclass(frozen=True, kw_only=True)
class Psnr:
    """PSNR of two videos, on all three channels of the codes as they are.

    The value is the PSNR **of the mean MSE** over the frames: that of the two videos taken as one large picture.
    Beside it stands the mean of the frames' PSNR, which is never less, by Jensen's inequality, and infinite as soon as
    one frame is without an error. What moves the number: which of the two; a cap on frames without an error (none
    here); the data range; grey or luma in place of the three channels.

    Parameters
    ----------
    data_range
        Largest value less smallest of the pictures' type.
    """

    data_range: float = 255.0

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> float:
        """Mean squared error of one pair of pictures, as `mse` takes them."""
        return mse(ref, gen)

    def pool(self, records: Sequence[float]) -> Score:
        """PSNR of the mean of the frames' errors."""
        frames: list[Value] = [psnr(error, self.data_range) for error in records]
        average = mean(records)
        value = average if isinstance(average, Undefined) else psnr(average, self.data_range)
        return Score(value=value, frames=tuple(frames), others={"mean of PSNR": mean(frames), "MSE": average})

    def summands(self, records: Sequence[float]) -> NDArray[np.float64]:
        """Errors and frames."""
        return summands_of_mean(records)

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """PSNR of the mean error."""
        average = mean_of_sums(sums)
        return average if isinstance(average, Undefined) else psnr(average, self.data_range)


PRESETS = {"scikit-image": Psnr()}
