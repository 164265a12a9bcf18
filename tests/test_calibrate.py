"""Calibration: scale and bias, ground plane, percentile of depth."""

from __future__ import annotations

import numpy as np
import pytest

from aw4d.calibrate.align import align_depth
from aw4d.calibrate.ground import fit_ground, scale_from_camera_height
from aw4d.calibrate.sky_depth import DepthPercentile
from aw4d.errors import InputError

UP = (0, -1, 0)


def relative_and_metric(count: int, outliers: float, noise: float = 0.0, seed: int = 0):
    """Pairs on metric = 40 relative + 2, with some of the metric depths replaced by any depth up to 80 m."""
    rng = np.random.default_rng(seed)
    relative = rng.uniform(0.05, 1.5, count)
    metric = (40 * relative + 2) * (1 + noise * rng.standard_normal(count))
    wrong = rng.random(count) < outliers
    metric[wrong] = rng.uniform(1, 80, np.count_nonzero(wrong))
    return relative, metric


def test_exact_pairs_give_exact_scale_and_bias():
    alignment = align_depth(*relative_and_metric(5000, 0), seed=1)
    assert alignment.scale == pytest.approx(40, rel=1e-12)
    assert alignment.bias == pytest.approx(2, rel=1e-10)
    assert alignment.inliers == alignment.pairs == 1000
    assert alignment.rmse < 1e-10


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("outliers", "error"), [(0.5, 0.01), (0.9, 0.05)])
def test_survives_outliers(outliers, error, seed):
    relative, metric = relative_and_metric(20_000, outliers, noise=0.01, seed=seed)
    alignment = align_depth(relative, metric, seed=seed)
    aligned = alignment.scale * relative + alignment.bias
    np.testing.assert_allclose(aligned, 40 * relative + 2, rtol=error)


def test_a_large_offset_costs_no_digits():
    relative = 1e6 + np.linspace(0, 1, 500)
    alignment = align_depth(relative, 10 + 5 * (relative - 1e6), seed=0)
    assert alignment.scale == pytest.approx(5, rel=1e-6)


def test_missing_returns_do_not_count():
    relative, metric = relative_and_metric(400, 0)
    metric[:100], relative[100:150], metric[150:200] = 0, np.nan, np.inf
    alignment = align_depth(relative.reshape(20, 20), metric.reshape(20, 20), seed=0)
    assert alignment.pairs == 200
    assert alignment.scale == pytest.approx(40)


def test_the_same_seed_gives_the_same_alignment():
    pairs = relative_and_metric(5000, 0.5)
    assert align_depth(*pairs, seed=7) == align_depth(*pairs, seed=7)


GROWING = np.linspace(1, 2, 50)


@pytest.mark.parametrize(
    ("relative", "metric", "message"),
    [
        (GROWING[:9], GROWING[:9], "at least 10 pairs of valid depth, got 9"),
        (np.full(50, np.nan), GROWING, "got 0 of 50"),
        (GROWING, np.zeros(50), "got 0 of 50"),
        (np.full(50, 3.0), GROWING, "relative depth that varies"),
        (GROWING, np.full(50, 3.0), "metric depth that varies"),
        (GROWING, 30 - 5 * GROWING, "grows with relative depth, got scale -5"),
        (GROWING, GROWING[:20], "one shape"),
        (np.linspace(1, 2, 12), 2.0 ** np.arange(12), "at least 10 pairs on one line"),
    ],
)
def test_refuses_what_cannot_be_aligned(relative, metric, message):
    with pytest.raises(InputError, match=message):
        align_depth(relative, metric, seed=0)


def road(count: int = 4000, *, height: float = 1.65, pitch: float = 0.05, noise: float = 0.01, seed: int = 0):
    """Points in the camera frame on a road seen by a pitched camera, and the road's upward normal."""
    rng = np.random.default_rng(seed)
    normal = np.array([0, -np.cos(pitch), -np.sin(pitch)])
    along = np.cross((1, 0, 0), normal)
    along *= np.sign(along[2])
    x, z = rng.uniform(-6, 6, count), rng.uniform(4, 40, count)
    points = (
        x[:, None] * (1, 0, 0) + z[:, None] * along - (height + noise * rng.standard_normal(count))[:, None] * normal
    )
    return points, normal


def test_ground_of_a_pitched_camera():
    points, normal = road()
    plane = fit_ground(points, up=UP, seed=0)
    assert plane.offset == pytest.approx(1.65, abs=2e-3)
    assert plane.normal @ normal > np.cos(1e-3)
    assert plane.inliers > 0.95
    assert np.abs(plane.height(points)).mean() < 0.01


def test_a_verge_above_the_kerb_does_not_tilt_the_road():
    points, normal = road(noise=0.01)
    points[points[:, 0] < -2.5] += 0.25 * normal
    plane = fit_ground(points, up=UP, seed=0)
    assert plane.normal @ normal > np.cos(np.deg2rad(0.2))
    assert plane.offset == pytest.approx(1.65, abs=0.01)


def test_clutter_does_not_move_the_ground():
    points, _ = road()
    clutter = np.random.default_rng(1).uniform((-10, -4, 4), (10, 1, 40), (6000, 3))
    assert fit_ground(np.concatenate([points, clutter]), up=UP, seed=0).offset == pytest.approx(1.65, abs=0.02)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 370.0])
def test_camera_height_gives_the_unit_back(unit):
    points, _ = road(height=1.65)
    scale = scale_from_camera_height(points / unit, camera_height_m=1.65, up=UP, seed=0)
    assert scale == pytest.approx(unit, rel=2e-3)


def wall(count: int = 2000):
    rng = np.random.default_rng(0)
    return np.column_stack([np.full(count, 5.0), rng.uniform(-20, 1.6, count), rng.uniform(5, 40, count)])


def ceiling():
    return road()[0] * (1, -1, 1)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (wall(), "inclined by 90 degrees"),
        (ceiling(), "below the camera"),
        (np.linspace((0, 1.6, 5), (0, 1.6, 50), 100), "one line"),
        (np.random.default_rng(0).uniform(-30, 30, (3000, 3)), "holds 20% of the points"),
        (road()[0][:9], "at least 10 points, got 9"),
        (np.full((50, 3), np.nan), "at least 10 points, got 0"),
        (np.zeros((50, 3)), "at least 10 points, got 0"),
    ],
)
def test_refuses_what_holds_no_ground(points, message):
    with pytest.raises(InputError, match=message):
        fit_ground(points, up=UP, seed=0)


@pytest.mark.parametrize("height", [0.0, -1.0, np.nan, np.inf])
def test_refuses_a_camera_height_that_is_none(height):
    with pytest.raises(InputError, match="camera_height_m"):
        scale_from_camera_height(road()[0], camera_height_m=height, up=UP, seed=0)


@pytest.mark.parametrize("up", [(0, 0, 0), (0, np.nan, 0), (0, 1)])
def test_refuses_an_up_that_is_no_direction(up):
    with pytest.raises(InputError, match="up"):
        fit_ground(road()[0], up=up, seed=0)


def frames(count: int = 7, seed: int = 0):
    rng = np.random.default_rng(seed)
    return [rng.lognormal(2.5, 1.0, (31, 47)).astype(np.float32) for _ in range(count)]


@pytest.mark.parametrize("percentile", [0, 1, 50, 99, 99.9, 100])
def test_percentile_agrees_with_all_frames_in_memory(percentile):
    histogram, kept = DepthPercentile(), []
    for number, depth in enumerate(frames()):
        sky = np.zeros(depth.shape, dtype=bool)
        sky[: number * 3] = True
        histogram.add(np.where(sky, np.float32(np.nan), depth), sky)
        kept.append(depth[~sky])
    expected = np.percentile(np.concatenate(kept), percentile)
    assert histogram.value(percentile) == pytest.approx(expected, rel=1.01e-3)


def test_percentile_of_few_depths_is_interpolated():
    histogram = DepthPercentile()
    histogram.add(np.array([[10, 20]], np.float32), np.zeros((1, 2), bool))
    assert histogram.value(50) == pytest.approx(15, rel=1e-3)


def test_memory_does_not_grow_with_the_clip():
    histogram = DepthPercentile()
    before = histogram._counts.nbytes
    for depth in frames(20):
        histogram.add(depth, np.zeros(depth.shape, bool))
    assert histogram._counts.nbytes == before
    assert histogram._counts.sum() == 20 * 31 * 47


def test_limits_of_the_range_are_counted():
    histogram = DepthPercentile()
    histogram.add(np.array([[1e-3, 1e5]], np.float32), np.zeros((1, 2), bool))
    assert histogram.value(0) == pytest.approx(1e-3, rel=1.01e-3)
    assert histogram.value(100) == pytest.approx(1e5, rel=1.01e-3)


@pytest.mark.parametrize("bad", [0, -1, np.nan, np.inf, 2e5])
def test_refuses_depth_that_is_none(bad):
    with pytest.raises(InputError, match="depth"):
        DepthPercentile().add(np.array([[5, bad]], np.float32), np.zeros((1, 2), bool))


def test_refuses_a_clip_of_sky_alone_and_a_percentile_beyond_100():
    histogram = DepthPercentile()
    histogram.add(np.ones((3, 3), np.float32), np.ones((3, 3), bool))
    with pytest.raises(InputError, match="sky"):
        histogram.value()
    histogram.add(np.ones((3, 3), np.float32), np.zeros((3, 3), bool))
    with pytest.raises(InputError, match="percentile"):
        histogram.value(101)
    with pytest.raises(InputError, match="shape"):
        histogram.add(np.ones((3, 3), np.float32), np.zeros((3, 2), bool))
