"""SSIM: how alike two pictures are in local mean, contrast and structure. Wang et al. 2004."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.pictures import check_pair
from eval.score import Score, mean_of_sums, summands_of_mean
from eval.values import Value, mean

TILE = 64  # side of what is worked on at once [px]: what belongs to it stays in the cache


@dataclass(frozen=True, kw_only=True)
class Ssim:
    """SSIM of two videos: the mean over the frames.

    With x and y under a Gaussian window, at every pixel whose window lies inside the picture,

        SSIM = (2 mu_x mu_y + C1) (2 cov_xy + C2) / ((mu_x^2 + mu_y^2 + C1) (var_x + var_y + C2)),

    C1 = (k1 data_range)^2, C2 = (k2 data_range)^2, variances over the window's weights (not the sample variances),
    averaged over pixels and over the channels R, G, B, each for itself. 1 for equal pictures, within [-1, 1].

    The same as scikit-image's `structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
    data_range=255, channel_axis=2)`. What moves the number: scikit-image's own default (7 x 7 pixels of equal weight,
    sample variances); grey or luma, as in the paper of 2004, in place of the channels; a data range taken from the
    picture; shrinking large pictures first, as the authors' script does.

    Parameters
    ----------
    data_range
        Largest value less smallest of the pictures' type: 255 for 8-bit codes.
    taps, sigma
        Width of the window [px], odd, and its standard deviation [px].
    k1, k2
        What keeps the fractions from 0/0, as shares of the data range.
    """

    data_range: float = 255.0
    taps: int = 11
    sigma: float = 1.5
    k1: float = 0.01
    k2: float = 0.03

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> float:
        """SSIM of one pair of pictures, (H, W) or (H, W, 3), both uint8 codes or both finite floats.

        Raises
        ------
        MetricError
            The pictures differ in shape or dtype, are of another kind, or are smaller than the window.

        Examples
        --------
        Two flat pictures differ in their means alone: (2 x 100 x 200 + C1) / (100^2 + 200^2 + C1).

        >>> black, grey = np.full((16, 16), 100, np.uint8), np.full((16, 16), 200, np.uint8)
        >>> round(Ssim().frame(black, grey), 6), round((40000 + 2.55**2) / (50000 + 2.55**2), 6)
        (0.800026, 0.800026)
        >>> Ssim().frame(black, black)
        1.0
        """
        check_pair("ssim", ref, gen)
        if min(ref.shape[:2]) < self.taps:
            raise MetricError(f"ssim: expected pictures of {self.taps} x {self.taps} pixels or more, got {ref.shape}")
        channels = ref.shape[2] if ref.ndim == 3 else 1
        inside = (ref.shape[0] - self.taps + 1) * (ref.shape[1] - self.taps + 1) * channels
        return sum(float(self._map(ref[tile], gen[tile]).sum()) for tile in self._tiles(*ref.shape[:2])) / inside

    def pool(self, records: Sequence[float]) -> Score:
        """Mean over the frames."""
        return Score(value=mean(records), frames=tuple(records))

    def summands(self, records: Sequence[float]) -> NDArray[np.float64]:
        """SSIM and frames."""
        return summands_of_mean(records)

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """Mean over the frames."""
        return mean_of_sums(sums)

    def _tiles(self, height: int, width: int) -> Iterator[tuple[slice, slice]]:
        """Parts of the picture that tile the map, each larger than its tile by the window."""
        rows, columns = (
            [slice(start, min(start + TILE, size) + self.taps - 1) for start in range(0, size, TILE)]
            for size in (height - self.taps + 1, width - self.taps + 1)
        )
        return itertools.product(rows, columns)

    def _map(self, ref: NDArray[Any], gen: NDArray[Any]) -> NDArray[np.float64]:
        """SSIM of the pixels whose window lies inside.

        From the sum u and the difference v of the two: mu_u^2 -+ mu_v^2 and var_u -+ var_v are twice what the formula
        needs, by four convolutions where x and y need five, and pictures that are equal give 1 to the last digit.
        In float64 E[u^2] - E[u]^2 keeps 12 digits of C2, where float32 would keep 4.
        """
        kernel = cv2.getGaussianKernel(self.taps, self.sigma, cv2.CV_64F)
        rim = self.taps // 2

        def smooth(plane: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray(cv2.sepFilter2D(plane, -1, kernel, kernel)[rim:-rim, rim:-rim])

        u, v = np.add(ref, gen, dtype=np.float64), np.subtract(ref, gen, dtype=np.float64)
        mean_u2, mean_v2 = smooth(u) ** 2, smooth(v) ** 2
        var_u, var_v = smooth(u * u) - mean_u2, smooth(v * v) - mean_v2
        c1, c2 = 2 * (self.k1 * self.data_range) ** 2, 2 * (self.k2 * self.data_range) ** 2
        return np.asarray(
            (mean_u2 - mean_v2 + c1) * (var_u - var_v + c2) / ((mean_u2 + mean_v2 + c1) * (var_u + var_v + c2))
        )


PRESETS = {"scikit-image": Ssim()}
