"""PSNR: analytic values, scikit-image, and which of the two means is which."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.metrics import peak_signal_noise_ratio

from eval.errors import MetricError
from eval.psnr import PRESETS, Psnr, mse, psnr
from eval.score import score
from eval.values import Undefined

DEFAULT = PRESETS["scikit-image"]


def noise(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


def marked(count: int) -> np.ndarray:
    """A picture of 100 pixels of which `count` are 1, the others 0."""
    return (np.arange(100) < count).astype(np.uint8).reshape(10, 10)


def test_psnr_of_the_mean_error_and_mean_of_psnr() -> None:
    found = score(Psnr(data_range=1.0), [marked(0)] * 2, [marked(50), marked(10)])
    assert found.value == pytest.approx(10 * math.log10(1 / 0.3)) == pytest.approx(5.23, abs=5e-3)
    assert found.others["mean of PSNR"] == pytest.approx(6.505, abs=1e-3)
    assert found.frames == (pytest.approx(3.0103, abs=1e-4), pytest.approx(10.0))


@pytest.mark.parametrize("shape", [(31, 17), (31, 17, 3), (704, 1280, 3)])
def test_scikit_image_agrees(shape: tuple[int, ...]) -> None:
    ref, gen = noise(0, *shape), noise(1, *shape)
    assert psnr(mse(ref, gen)) == pytest.approx(peak_signal_noise_ratio(ref, gen, data_range=255), rel=1e-12)
    unit = ref / 255, gen / 255
    assert psnr(mse(*unit), 1.0) == pytest.approx(peak_signal_noise_ratio(*unit, data_range=1), rel=1e-12)


def test_the_largest_error_there_is() -> None:
    black, white = np.zeros((704, 1280, 3), np.uint8), np.full((704, 1280, 3), 255, np.uint8)
    assert mse(black, white) == 255**2
    assert psnr(mse(black, white)) == 0


def test_equal_videos_are_infinite() -> None:
    found = score(DEFAULT, [noise(0, 8, 8, 3)] * 2, [noise(0, 8, 8, 3)] * 2)
    assert found.value == found.others["mean of PSNR"] == math.inf


def test_one_equal_frame_makes_the_mean_of_psnr_infinite_but_not_the_value() -> None:
    found = score(DEFAULT, [marked(0)] * 2, [marked(0), marked(10)])
    assert found.others["mean of PSNR"] == math.inf
    assert found.value == pytest.approx(psnr(0.05))


@given(st.lists(st.floats(1e-6, 65025), min_size=1))
def test_the_mean_of_psnr_is_never_less(errors: list[float]) -> None:
    found = DEFAULT.pool(errors)
    assert not isinstance(found.value, Undefined)
    assert found.others["mean of PSNR"] >= found.value - 1e-9


def test_no_frames_no_value() -> None:
    assert isinstance(DEFAULT.pool([]).value, Undefined)


@pytest.mark.parametrize(
    ("ref", "gen", "message"),
    [
        (np.zeros((4, 5)), np.zeros((5, 4)), "shape"),
        (np.zeros((4, 5)), np.zeros((4, 5), np.uint8), "dtype"),
        (np.zeros((4, 5), np.int64), np.zeros((4, 5), np.int64), "int64"),
        (np.full((4, 5), np.nan), np.zeros((4, 5)), "NaN"),
        (np.zeros((4, 5, 4)), np.zeros((4, 5, 4)), "expected pictures"),
        (np.zeros((0, 5)), np.zeros((0, 5)), "expected pictures"),
    ],
)
def test_what_is_no_pair_of_pictures_is_refused(ref: np.ndarray, gen: np.ndarray, message: str) -> None:
    with pytest.raises(MetricError, match=message):
        mse(ref, gen)
