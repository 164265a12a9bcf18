"""Shadows that stay: on roads whose shadows are exact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.luminance import LINEAR
from eval.shadow import Shadow, borders, gradient
from eval.values import Undefined
from eval.view import View

Array = NDArray[np.float64]
HEIGHT, WIDTH = 160, 240
K = np.array([[200.0, 0, 119.5], [0, 200.0, 10.0], [0, 0, 1]])
NOTHING = np.zeros((HEIGHT, WIDTH), np.bool_)
SUN, SKY = np.array([0.9, 0.8, 0.65]), np.array([0.16, 0.18, 0.22])  # irradiance, red, green, blue
METRIC = Shadow()


def encode(linear: Array) -> NDArray[np.uint8]:
    """Nearest 8-bit codes of linear light."""
    return np.searchsorted((LINEAR[1:] + LINEAR[:-1]) / 2, np.clip(linear, 0, 1)).astype(np.uint8)


def blob() -> NDArray[np.bool_]:
    """Where the road lies in the shadow of a crown."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return np.asarray(np.hypot((x - 90) / 1.5, y - 80) < 32 + 6 * np.sin(np.arctan2(y - 80, x - 90) * 7))


def grain(seed: int = 0) -> Array:
    """Albedo of asphalt."""
    return 0.25 * np.random.default_rng(seed).normal(1, 0.03, (HEIGHT, WIDTH, 1))


def sunny(albedo: Array) -> NDArray[np.uint8]:
    """The road in the sun, and out of it in the shadow."""
    return encode(albedo * (SKY + SUN * ~blob()[..., None]))


def level_road() -> View:
    """A road 1.5 m below the camera."""
    rows = np.arange(HEIGHT)[:, None] + np.zeros(WIDTH)
    return View(depth=200 * 1.5 / np.maximum(rows - 9.0, 1.0), K=K, sky=rows < 10, moving=NOTHING)


def outline(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels with a neighbour of the other kind."""
    out = np.zeros_like(mask)
    for axis in (0, 1):
        for shift in (-1, 1):
            out |= mask != np.roll(mask, shift, axis)
    return out


def grown(mask: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """A mask and all within some pixels of it."""
    for _ in range(pixels):
        mask = mask | outline(mask)
    return mask


WHERE = grown(outline(blob()), 3)


def values(gen: NDArray[np.uint8]) -> tuple[float, float]:
    """Correlation with the sunny road, and strength left."""
    score = METRIC.pool([METRIC.frame(sunny(grain()), gen, WHERE)])
    left = score.others["strength left"]
    assert isinstance(score.value, float)
    assert isinstance(left, float)
    return score.value, left


def test_the_source_keeps_all_of_its_shadows() -> None:
    assert values(sunny(grain())) == pytest.approx((1, 1), abs=1e-12)


def test_brightness_does_not_matter() -> None:
    correlation, left = values(encode(0.5 * grain() * (SKY + SUN * ~blob()[..., None])))
    assert correlation > 0.995
    assert left == pytest.approx(1, abs=0.05)


def test_a_cloudy_road_with_grain_of_its_own_has_none() -> None:
    correlation, left = values(encode(grain(seed=1) * np.ones(3)))
    assert abs(correlation) < 0.1
    assert abs(left) < 0.01


def test_an_even_picture_has_none() -> None:
    assert values(np.full((HEIGHT, WIDTH, 3), 90, np.uint8)) == (0, 0)


def test_shadows_of_half_the_contrast_are_there_with_half_the_strength() -> None:
    light = SKY + SUN * ~blob()[..., None]
    even = np.full_like(light, float(light.mean()))
    correlation, left = values(encode(np.sqrt(0.25 * light * 0.25 * even)))
    assert correlation > 0.95
    assert left == pytest.approx(0.5, abs=0.05)


def test_light_where_the_shadow_was_counts_against() -> None:
    correlation, left = values(encode(grain() * (SKY + SUN * blob()[..., None])))
    assert correlation < -0.5
    assert left < -0.5


def test_borders_are_found_on_the_shadow_and_not_on_paint() -> None:
    albedo = grain()
    albedo[100:140, 190:196] = 0.8  # a line of white paint
    found = borders(sunny(albedo), ~NOTHING, level_road())
    edge = outline(blob())
    assert (grown(found, 2) & edge).sum() > 0.95 * edge.sum()
    assert (found & ~grown(edge, 6)).sum() < 0.01 * found.sum()


def test_borders_are_looked_for_on_the_ground_alone() -> None:
    half = NOTHING.copy()
    half[:, :90] = True
    found = borders(sunny(grain()), half, level_road())
    assert found[:, :85].any()
    assert not found[:, 87:].any()
    road = level_road()
    covered = View(depth=road.depth, K=K, sky=road.sky, moving=half)
    assert not borders(sunny(grain()), half, covered).any()


def test_what_changes_shape_is_no_shadow() -> None:
    road = level_road()
    steps = View(depth=np.where(blob(), 0.8, 1) * road.depth, K=K, sky=road.sky, moving=NOTHING)
    on_road, on_steps = (borders(sunny(grain()), ~NOTHING, view) & outline(blob()) for view in (road, steps))
    assert on_steps.sum() < 0.02 * on_road.sum()


def test_a_source_without_shadows_is_undefined() -> None:
    overcast = encode(grain() * np.array([0.5, 0.5, 0.5]))
    where = borders(overcast, ~NOTHING, level_road())
    score = METRIC.pool([METRIC.frame(overcast, overcast, where)])
    assert score.value == Undefined("no shadow boundaries")
    assert score.others["strength left"] == Undefined("no shadow boundaries")
    assert METRIC.pool([]).value == Undefined("no shadow boundaries")


def test_frames_are_pooled_by_their_products() -> None:
    sun, cloud = sunny(grain()), encode(grain(seed=1) * np.ones(3))
    kept, gone = METRIC.frame(sun, sun, WHERE), METRIC.frame(sun, cloud, WHERE)
    score = METRIC.pool([kept, gone, METRIC.frame(sun, sun, NOTHING)])
    assert score.others["strength left"] == pytest.approx((1 + gone.ref_gen / gone.ref_ref) / 2)
    assert score.frames[2] == Undefined("no shadow boundaries")
    assert score.others["border pixels"] == 2 * WHERE.sum()


def test_the_gradient_is_exact_on_a_ramp() -> None:
    y, x = np.mgrid[:9, :9].astype(np.float32)
    inner = gradient(0.5 * x - 2 * y)[1:-1, 1:-1]
    np.testing.assert_allclose(inner, np.broadcast_to([0.5, -2.0], inner.shape), rtol=1e-6)


def test_broken_input_is_an_error_that_names_it() -> None:
    sun = sunny(grain())
    with pytest.raises(MetricError, match=r"shadow: expected two pictures of one size"):
        METRIC.frame(sun, sun[1:], WHERE)
    with pytest.raises(MetricError, match=r"shadow: expected borders \(160, 240\) bool, got \(160, 240\) uint8"):
        METRIC.frame(sun, sun, WHERE.astype(np.uint8))
    with pytest.raises(MetricError, match=r"ground: expected \(160, 240\) bool, got \(159, 240\) bool"):
        borders(sun, WHERE[1:], level_road())
