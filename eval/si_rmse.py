"""Depth si-RMSE: how far two depth maps lie apart once their scales are made equal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.score import Score, mean_of_sums, summands_of_mean
from eval.values import Undefined, Value, mean

NO_DEPTH = Undefined("no pixel has a depth on both sides")


def eigen(gen: NDArray[Any], ref: NDArray[Any]) -> float:
    """Scale-invariant error in log space: the standard deviation of log gen - log ref. Eigen, Puhrsch & Fergus 2014.

    The square root of their scale-invariant mean squared error; 0 for maps that differ by a factor. In float64, about
    the mean first found: mean(d^2) - mean(d)^2 loses its digits where the maps are nearly alike.

    Parameters
    ----------
    gen, ref
        Depths > 0, (N,), N >= 1, of the same pixels; any unit.

    Examples
    --------
    >>> g = np.array([1.0, 2.0, 5.0, 9.0])
    >>> eigen(3 * g, g) < 1e-15
    True
    >>> round(eigen(g * [2, 2, 1, 1], g), 5)  # ln 2 / 2
    0.34657
    """
    return float(np.std(np.log(gen.astype(np.float64) / ref)))


def median_scaled(gen: NDArray[Any], ref: NDArray[Any], cap: float | None = None) -> float:
    """Root mean square of ref - s gen, with s = median(ref) / median(gen); in the unit of `ref`.

    Parameters
    ----------
    gen, ref
        Depths > 0, (N,), N >= 1, of the same pixels.
    cap
        Largest error of a pixel, in the unit of `ref`; larger ones count as this.

    Examples
    --------
    >>> median_scaled(np.array([2.0, 4.0, 6.0]), np.array([1.0, 2.0, 6.0]))  # errors 0, 0, 3
    1.7320508075688772
    """
    p, g = gen.astype(np.float64), ref.astype(np.float64)
    error = g - np.median(g) / np.median(p) * p
    if cap is not None:
        error = np.clip(error, -cap, cap)
    return float(np.sqrt(np.mean(error * error)))


class DepthError(NamedTuple):
    """Error of one frame, and the share of its pixels that have no depth on one side or the other."""

    error: Value
    left_out: float


def _depth(values: NDArray[Any], disparity: bool) -> NDArray[Any]:
    with np.errstate(divide="ignore"):
        return np.reciprocal(values, dtype=np.float64) if disparity else values


@dataclass(frozen=True, kw_only=True)
class SiRmse:
    """Depth si-RMSE of two videos: the mean over the frames, each with a scale of its own.

    Pixels that are 0, negative, NaN or infinite on either side have no depth: they leave the pair, and the share that
    left is told; a frame without any other is undefined. pai-bench counts such a frame as 0. What moves the number:
    the logarithm (`eigen`, without a unit) or metres (`pai-bench`, which far pixels rule); the cap of 10 m, which not
    every revision of pai-bench's script has; disparities taken for depths, for which `pai-bench` answers another
    number and `eigen` the same, if it happens to both sides; the sky's depth; and the depth model itself.

    Parameters
    ----------
    scaling
        "log mean" for `eigen`, "median" for `median_scaled`.
    cap
        Largest error of a pixel in the unit of ref, for `median_scaled`; None for no limit.
    ref_disparity, gen_disparity
        That side holds disparities, as Depth Anything answers: depth is their reciprocal.
    """

    scaling: Literal["log mean", "median"] = "log mean"
    cap: float | None = None
    ref_disparity: bool = False
    gen_disparity: bool = False

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> DepthError:
        """Error of one pair of depth maps, (H, W) floats.

        Raises
        ------
        MetricError
            The maps differ in shape, or are no maps of floats.
        """
        for side, values in (("ref", ref), ("gen", gen)):
            if values.ndim != 2 or not values.size or values.dtype.kind != "f":
                raise MetricError(f"si-rmse: {side}: expected depths (H, W) float, got {values.shape} {values.dtype}")
        if ref.shape != gen.shape:
            raise MetricError(f"si-rmse: expected two depth maps of one shape, got {ref.shape} and {gen.shape}")
        g, p = _depth(ref, self.ref_disparity), _depth(gen, self.gen_disparity)
        valid = np.isfinite(g) & np.isfinite(p) & (g > 0) & (p > 0)
        left_out = 1 - np.count_nonzero(valid) / valid.size
        return DepthError(self._error(p[valid], g[valid]) if valid.any() else NO_DEPTH, left_out)

    def pool(self, records: Sequence[DepthError]) -> Score:
        """Mean over the frames that have depths on both sides."""
        frames = tuple(record.error for record in records)
        others = {"share of pixels left out": mean([record.left_out for record in records])}
        return Score(value=mean(frames), frames=frames, others=others)

    def summands(self, records: Sequence[DepthError]) -> NDArray[np.float64]:
        """Errors and frames that have one."""
        return summands_of_mean([record.error for record in records])

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """Mean over the frames that have depths on both sides."""
        return mean_of_sums(sums)

    def _error(self, gen: NDArray[Any], ref: NDArray[Any]) -> float:
        return eigen(gen, ref) if self.scaling == "log mean" else median_scaled(gen, ref, self.cap)


PRESETS = {"paper": SiRmse(), "eigen": SiRmse(), "pai-bench": SiRmse(scaling="median", cap=10.0)}
