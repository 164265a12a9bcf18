"""Depth si-RMSE: scale does not count, closed forms, and pixels without a depth leave the pair and are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eval.errors import MetricError
from eval.score import score
from eval.si_rmse import PRESETS, SiRmse, eigen, median_scaled
from eval.values import Undefined, undefined

EIGEN, PAI_BENCH = PRESETS["eigen"], PRESETS["pai-bench"]


def depths(*shape: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(2, 80, shape or (20, 30)).astype(np.float32)


@pytest.mark.parametrize("metric", PRESETS.values())
@pytest.mark.parametrize("factor", [1, 3, 1e-3])
def test_a_scale_does_not_count(metric: SiRmse, factor: float) -> None:
    error, left_out = metric.frame(depths(), depths().astype(np.float64) * factor)
    assert error == pytest.approx(0, abs=1e-12)
    assert left_out == 0


def test_half_of_the_pixels_twice_as_far() -> None:
    gen = depths()
    gen[:, ::2] *= 2
    assert score(EIGEN, [depths()], [gen]).value == pytest.approx(math.log(2) / 2, rel=1e-12)


@given(st.floats(0.01, 0.99), st.floats(0.1, 10))
def test_two_kinds_of_pixels(share: float, factor: float) -> None:
    # A share q of the pixels is off by a factor f: the deviation is |ln f| sqrt(q (1 - q)).
    count = 1000
    few = round(share * count)
    gen = np.where(np.arange(count) < few, factor, 1.0)
    q = few / count
    assert eigen(gen, np.ones(count)) == pytest.approx(abs(math.log(factor)) * math.sqrt(q * (1 - q)), abs=1e-12)


def test_nearly_equal_maps_keep_their_digits() -> None:
    ref = depths(100, 100).astype(np.float64).ravel()
    gen = 7 * ref * np.where(np.arange(ref.size) % 2, 1 + 1e-8, 1 - 1e-8)
    assert eigen(gen, ref) == pytest.approx(1e-8, rel=1e-6)
    d = np.log(gen.astype(np.float32)) - np.log(ref.astype(np.float32))
    assert math.sqrt(abs(np.mean(d * d) - np.mean(d) ** 2)) > 1e-7  # why not in one pass of float32


def test_median_scaled_by_hand() -> None:
    ref, gen = np.array([1.0, 2.0, 3.0, 10.0]), np.array([1.0, 1.0, 4.0, 5.0])  # medians 2.5 and 2.5
    assert median_scaled(gen, ref) == pytest.approx(math.sqrt((0 + 1 + 1 + 25) / 4))
    assert median_scaled(gen, ref, cap=2.0) == pytest.approx(math.sqrt((0 + 1 + 1 + 4) / 4))


def test_pai_bench_is_in_metres_per_frame_and_capped() -> None:
    ref = np.full((2, 5), 20.0)
    gen = ref.copy()
    gen[0, 0] = 100.0
    assert PAI_BENCH.frame(ref, gen).error == pytest.approx(math.sqrt(10**2 / 10))
    assert PAI_BENCH.frame(2 * ref, 2 * gen).error == pytest.approx(math.sqrt(10**2 / 10))
    assert PAI_BENCH.frame(ref / 10, gen / 10).error == pytest.approx(math.sqrt(8**2 / 10))


@pytest.mark.parametrize("nothing", [0.0, -1.0, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("metric", [EIGEN, PAI_BENCH])
def test_a_pixel_without_depth_leaves_the_pair(metric: SiRmse, side: int, nothing: float) -> None:
    maps = [depths(), depths() * 2]
    maps[1][5, 5] *= 3
    whole = metric.frame(maps[0][4:], maps[1][4:])
    maps[side][:4] = nothing
    found = metric.frame(*maps)
    assert found.error == whole.error
    assert found.left_out == pytest.approx(4 / 20)


def test_a_frame_without_depth_is_undefined_and_counted() -> None:
    empty = np.full((20, 30), np.nan, np.float32)
    found = score(EIGEN, [depths(), depths()], [depths(), empty])
    assert undefined(found.frames) == {"no pixel has a depth on both sides": 1}
    assert found.value == 0.0
    assert found.others["share of pixels left out"] == 0.5
    assert isinstance(score(EIGEN, [empty], [empty]).value, Undefined)
    assert isinstance(EIGEN.pool([]).value, Undefined)


def test_disparities_are_told_not_guessed() -> None:
    ref, gen = depths().astype(np.float64), 1 / depths().astype(np.float64)
    assert EIGEN.frame(ref, gen).error > 1
    for metric in (SiRmse(gen_disparity=True), SiRmse(gen_disparity=True, scaling="median")):
        assert metric.frame(ref, gen).error == pytest.approx(0, abs=1e-12)
    assert SiRmse(ref_disparity=True).frame(gen, ref).error == pytest.approx(0, abs=1e-12)


def test_the_deviation_of_logarithms_is_the_same_for_disparities_on_both_sides() -> None:
    ref, gen = depths(), depths() * np.linspace(1, 2, 30, dtype=np.float32)
    both = SiRmse(ref_disparity=True, gen_disparity=True)
    assert both.frame(ref, gen).error == pytest.approx(EIGEN.frame(ref, gen).error, rel=1e-12)


def test_no_disparity_is_no_depth() -> None:
    gen = 1 / depths()
    gen[0] = 0
    assert SiRmse(gen_disparity=True).frame(depths(), gen).left_out == pytest.approx(1 / 20)


@pytest.mark.parametrize(
    ("ref", "gen", "message"),
    [
        (depths(), depths()[:-1], "one shape"),
        (depths(), depths()[..., None], "gen"),
        (np.ones((3, 4), np.uint16), depths(3, 4), "ref.*uint16"),
        (depths()[:0], depths()[:0], "ref"),
    ],
)
def test_what_is_no_pair_of_depths_is_refused(ref: np.ndarray, gen: np.ndarray, message: str) -> None:
    with pytest.raises(MetricError, match=message):
        EIGEN.frame(ref, gen)
