"""SSIM: scikit-image to the last digits, flat pictures in closed form, and what the index must do."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from eval.errors import MetricError
from eval.score import score
from eval.ssim import PRESETS, TILE, Ssim
from eval.values import Undefined

DEFAULT = PRESETS["scikit-image"]


def scene(*shape: int) -> np.ndarray:
    """Blobs of all sizes, with flat black and white."""
    rng = np.random.default_rng(0)
    rough = np.cumsum(np.cumsum(rng.normal(size=shape), axis=0), axis=1)
    return np.clip(128 + 100 * rough / np.abs(rough).max() * 2, 0, 255).astype(np.uint8)


def noisy(picture: np.ndarray, sigma: float) -> np.ndarray:
    added = np.random.default_rng(1).normal(0, sigma, picture.shape)
    return np.clip(picture + added, 0, 255).astype(np.uint8)


def scikit_image(ref: np.ndarray, gen: np.ndarray, data_range: float = 255) -> float:
    return float(
        structural_similarity(
            ref,
            gen,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
            data_range=data_range,
            channel_axis=2 if ref.ndim == 3 else None,
        )
    )


SHAPES = [(11, 11), (11, 40, 3), (TILE + 10, TILE + 10), (TILE + 11, 2 * TILE + 11, 3), (375, 1242, 3)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("sigma", [0.5, 20.0])
def test_scikit_image_agrees(shape: tuple[int, ...], sigma: float) -> None:
    ref = scene(*shape)
    gen = noisy(ref, sigma)
    assert DEFAULT.frame(ref, gen) == pytest.approx(scikit_image(ref, gen), abs=1e-11)


def test_floats_of_another_range() -> None:
    ref = scene(40, 50, 3) / 255
    gen = noisy(scene(40, 50, 3), 9) / 255
    assert Ssim(data_range=1.0).frame(ref, gen) == pytest.approx(scikit_image(ref, gen, 1), abs=1e-11)


@pytest.mark.parametrize(("x", "y"), [(0, 255), (100, 200), (7, 8)])
def test_flat_pictures_differ_in_their_means_alone(x: int, y: int) -> None:
    c1 = (0.01 * 255) ** 2
    found = DEFAULT.frame(np.full((80, 90), x, np.uint8), np.full((80, 90), y, np.uint8))
    assert found == pytest.approx((2 * x * y + c1) / (x * x + y * y + c1), rel=1e-12)


def test_equal_pictures_are_exactly_one() -> None:
    found = score(DEFAULT, [scene(60, 70, 3)] * 3, [scene(60, 70, 3)] * 3)
    assert (found.value, found.frames) == (1.0, (1.0, 1.0, 1.0))


def test_a_negative_has_the_structure_reversed() -> None:
    grain = np.random.default_rng(0).integers(0, 256, (64, 64), dtype=np.uint8)
    assert -1 <= DEFAULT.frame(grain, 255 - grain) < -0.5


def test_both_sides_count_the_same_and_noise_makes_it_worse() -> None:
    ref = scene(100, 120, 3)
    found = [DEFAULT.frame(ref, noisy(ref, sigma)) for sigma in (1, 4, 16, 64)]
    assert found == sorted(found, reverse=True)
    assert DEFAULT.frame(ref, noisy(ref, 9)) == pytest.approx(DEFAULT.frame(noisy(ref, 9), ref), rel=1e-12)


def test_the_value_is_the_mean_over_frames() -> None:
    ref = scene(30, 30)
    found = score(DEFAULT, [ref, ref], [ref, noisy(ref, 30)])
    assert found.value == pytest.approx(np.mean(found.frames))
    assert isinstance(DEFAULT.pool([]).value, Undefined)


@pytest.mark.parametrize("shape", [(10, 40), (40, 10, 3)])
def test_a_picture_smaller_than_the_window_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(MetricError, match="11 x 11"):
        DEFAULT.frame(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))
