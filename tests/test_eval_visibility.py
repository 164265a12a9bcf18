"""Visibility: fitted on scenes whose fog is exact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.luminance import LINEAR
from eval.score import Score
from eval.values import Undefined
from eval.view import View
from eval.visibility import DarkLevels, Visibility, fit, sigma_to_visibility
from reference_numpy.fog import fog

Array = NDArray[np.float64]
SHAPE = (240, 400)
K = np.array([[220.0, 0, 199.5], [0, 220.0, 119.5], [0, 0, 1]])  # so wide that range and depth differ by up to 43 %
AIRLIGHT = 0.5
METRIC = Visibility()


def encode(linear: Array) -> NDArray[np.uint8]:
    """Nearest 8-bit code of linear light, grey; (H, W) to (H, W, 3)."""
    codes = np.searchsorted((LINEAR[1:] + LINEAR[:-1]) / 2, np.clip(linear, 0, 1))
    return np.repeat(codes.astype(np.uint8)[..., None], 3, axis=2)


def boards(rng: np.random.Generator, *, sky_rows: int = 40) -> tuple[Array, View]:
    """Radiance (H, W) and geometry of upright boards of 20 px, 8 to 150 m away, painted at random, in uneven light."""
    height, width = SHAPE

    def blocks(size: int, values: Array) -> Array:
        return np.asarray(np.kron(values, np.ones((size, size))), dtype=np.float64)

    depth = blocks(20, np.exp(rng.uniform(np.log(8), np.log(150), (height // 20, width // 20))))
    paint = blocks(4, rng.uniform(0.02, 0.8, (height // 4, width // 4)))
    light = blocks(40, rng.uniform(0.3, 1.0, (height // 40, width // 40)))
    sky = np.arange(height)[:, None] + np.zeros(width) < sky_rows
    view = View(depth=depth, K=K, sky=sky, moving=np.zeros(SHAPE, np.bool_))
    return np.where(sky, AIRLIGHT, paint * light), view


def veiled(radiance: Array, view: View, visibility_m: float) -> Array:
    """Koschmieder's fog: J T + A (1 - T)."""
    T = np.where(view.sky, 0, np.exp(np.log(0.02) / visibility_m * view.ranges()))
    return radiance * T + AIRLIGHT * (1 - T)


def clip_score(visibility_m: float, *, exposure: float = 1.0, sky_rows: int = 40) -> Score:
    """Score of six frames of boards in fog."""
    rng = np.random.default_rng(7)
    scenes = [boards(rng, sky_rows=sky_rows) for _ in range(6)]
    return METRIC.pool([METRIC.frame(encode(exposure * veiled(J, view, visibility_m)), view) for J, view in scenes])


@pytest.mark.parametrize("visibility_m", [50, 60, 100, 150, 200, 400])
def test_the_fog_that_was_put_in_is_found_within_two_percent(visibility_m: float) -> None:
    score = clip_score(visibility_m)
    assert score.value == pytest.approx(visibility_m, rel=0.02)
    assert score.others["horizon"] == pytest.approx(AIRLIGHT, rel=0.01)
    assert all(value == pytest.approx(visibility_m, rel=0.2) for value in score.frames)


def test_a_picture_half_as_bright_has_the_same_visibility() -> None:
    assert clip_score(100, exposure=0.5).value == pytest.approx(100, rel=0.02)


def test_the_sky_is_not_needed_in_dense_fog() -> None:
    assert clip_score(60, sky_rows=0).value == pytest.approx(60, rel=0.02)


def test_a_sky_that_is_not_the_airlight_does_not_matter_where_surfaces_show_it() -> None:
    rng = np.random.default_rng(11)
    records = []
    for _ in range(6):
        radiance, view = boards(rng)
        records.append(METRIC.frame(encode(np.where(view.sky, 0.9, veiled(radiance, view, 80))), view))
    assert METRIC.pool(records).value == pytest.approx(80, rel=0.02)


def test_agrees_with_the_renderers_own_fog() -> None:
    rng = np.random.default_rng(3)
    records = []
    for _ in range(4):
        radiance, view = boards(rng)
        out = fog(
            rgb=np.repeat(radiance[..., None], 3, axis=2),
            depth=view.depth.astype(np.float64),
            sky=view.sky,
            fx=K[0, 0],
            fy=K[1, 1],
            cx=K[0, 2],
            cy=K[1, 2],
            light_air_floor=np.zeros(0),
            light_kind=np.zeros(0, np.int32),
            light_position=np.zeros((0, 3)),
            light_direction=np.zeros((0, 3)),
            light_intensity=np.zeros((0, 3)),
            light_cos_inner=np.zeros(0),
            light_cos_outer=np.zeros(0),
            light_r_max=np.zeros(0),
            sigma_s=0.025,
            sigma_a=0.0,
            alpha=1.0,
            g=0.8,
            gamma=1.0,
            beta=0.0,
            color=(AIRLIGHT,) * 3,
            nodes=8,
            extent_m=2e4,
            convention="physical",
        )
        records.append(METRIC.frame(encode(out["rgb"][..., 0]), view))
    assert METRIC.pool(records).others["sigma_t"] == pytest.approx(0.025, rel=0.02)


def test_thinner_fog_reads_thinner() -> None:
    values = [clip_score(v).value for v in (50, 100, 200)]
    assert not any(isinstance(value, Undefined) for value in values)
    assert values == sorted(values)  # type: ignore[type-var]


def test_the_error_is_that_of_repeated_measurement() -> None:
    rng = np.random.default_rng(4)
    s = np.geomspace(10, 100, 25)
    veils = [fit(s, 0.5 * (1 - 0.9 * np.exp(-0.04 * s)) + rng.normal(0, 4e-3, len(s))) for _ in range(200)]
    found = [veil for veil in veils if not isinstance(veil, Undefined)]
    spread = np.std([veil.sigma_t for veil in found])
    assert np.mean([veil.error for veil in found]) == pytest.approx(spread, rel=0.2)
    assert np.mean([veil.sigma_t for veil in found]) == pytest.approx(0.04, rel=0.01)


def test_the_least_visibility_is_the_end_of_the_interval() -> None:
    others = clip_score(150).others
    low, sigma_t, high = (others[name] for name in ("sigma_t low", "sigma_t", "sigma_t high"))
    assert isinstance(low, float)
    assert isinstance(sigma_t, float)
    assert isinstance(high, float)
    assert low < sigma_t < high
    assert others["least visibility"] == pytest.approx(sigma_to_visibility(high))


def test_clear_air_is_undefined_and_bounded_from_below() -> None:
    score = clip_score(1e7)
    assert score.value == Undefined("extinction within the depth's reach is not told from none")
    least = score.others["least visibility"]
    assert isinstance(least, float)
    assert least > 1000


def test_light_that_falls_off_from_the_camera_is_no_fog() -> None:
    rng = np.random.default_rng(5)
    records = []
    for _ in range(4):
        radiance, view = boards(rng)
        near = np.where(view.sky, 0.01, radiance * np.exp(-view.ranges() / 40))
        records.append(METRIC.frame(encode(near), view))
    assert isinstance(METRIC.pool(records).value, Undefined)


def test_fog_that_hides_all_is_undefined() -> None:
    assert clip_score(1).value == Undefined("surfaces of all ranges are alike")


def test_surfaces_at_one_range_are_undefined() -> None:
    _, view = boards(np.random.default_rng(0), sky_rows=0)
    wall = View(depth=np.full(SHAPE, 20.0), K=np.diag([1e5, 1e5, 1.0]), sky=view.sky, moving=view.moving)
    picture = encode(np.random.default_rng(0).uniform(0, 1, SHAPE))
    assert METRIC.pool([METRIC.frame(picture, wall)]).value == Undefined("surfaces at fewer than 6 ranges")
    assert isinstance(METRIC.pool([]).value, Undefined)


def test_the_order_of_frames_does_not_matter_and_records_are_small() -> None:
    rng = np.random.default_rng(2)
    records = []
    for _ in range(3):
        radiance, view = boards(rng)
        records.append(METRIC.frame(encode(veiled(radiance, view, 80)), view))
    assert METRIC.pool(records).value == pytest.approx(METRIC.pool(records[::-1]).value, rel=1e-9)
    assert sum(part.nbytes for part in records[0][:3]) < 2000
    assert isinstance(records[0], DarkLevels)


def test_broken_input_is_an_error_that_names_it() -> None:
    radiance, view = boards(np.random.default_rng(0))
    with pytest.raises(MetricError, match=r"expected a picture \(H, W, 3\) uint8, got \(240, 400\) float64"):
        METRIC.frame(radiance, view)  # type: ignore[arg-type]
    with pytest.raises(MetricError, match=r"depth's size \(240, 400\), got \(240, 398\)"):
        METRIC.frame(encode(radiance)[:, :-2], view)
    depth = np.array(view.depth)
    depth[200, 7] = np.nan
    with pytest.raises(MetricError, match="depth: expected finite metres > 0 off the sky, got 1 pixels"):
        View(depth=depth, K=K, sky=view.sky, moving=view.moving)
    with pytest.raises(MetricError, match=r"sky: expected .* bool, got .* uint8"):
        View(depth=view.depth, K=K, sky=view.sky.astype(np.uint8), moving=view.moving)
    depth[200, 7], depth[0, 0] = 20.0, np.nan
    View(depth=depth, K=K, sky=view.sky, moving=view.moving)  # the sky needs no depth
