"""Falling snow: sizes, speeds and rates, the way of the flakes, the picture, and every kernel against the reference."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.params import SnowFallParams
from aw4d.scene import Scene
from aw4d.world.falling import snow_arguments
from aw4d.world.sizes import flake_diameter, flake_speed, rain_extinction, snow_extinction, snow_sizes
from reference_numpy.capsules import CLASSES
from tests.falling_inputs import check, clip, even, frame, on, reference, scene
from tests.fog_inputs import all_kinds, street_lamps

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend


def params(**changes: Any) -> SnowFallParams:
    return SnowFallParams(**({"rate_mm_h": 4.0, "flakes": 300} | changes))


# ---- what falls


def test_a_flake_weighs_as_much_as_its_water() -> None:
    D = np.linspace(0.3, 4, 20)
    d = flake_diameter(D)
    assert np.allclose(d**3 * (0.17 / d), D**3)  # density times volume; Holroyd 1971
    assert (d > D).all()


def test_flakes_fall_at_about_a_metre_a_second() -> None:
    speed = flake_speed(np.array([1.0, 5.0, 15.0]))
    assert (np.diff(speed) > 0).all()
    assert (speed > 0.7).all()
    assert (speed < 1.3).all()


@pytest.mark.parametrize("rate", [0.2, 1.5, 4.0])
def test_the_flakes_add_up_to_the_rate(rate: float) -> None:
    sizes = snow_sizes(rate)
    melted = np.cbrt(0.17 * sizes.diameter_mm**2)
    litres = np.pi / 6 * (melted * 1e-3) ** 3 * 1e3
    assert (sizes.number * litres * sizes.speed).sum() * 3600 == pytest.approx(rate, rel=1e-9)
    N0 = sizes.number / np.exp(-2.55 * rate**-0.48 * melted) / np.diff(melted)[0]
    assert np.allclose(N0, N0[0])
    assert N0[0] == pytest.approx(3.8e3 * rate**-0.87, rel=0.4)  # Gunn and Marshall 1958


def test_snow_hides_more_than_rain() -> None:
    assert snow_extinction(0.0) == 0
    assert snow_extinction(2.0) > 5 * rain_extinction(2.0)
    assert 300 < 3.912 / snow_extinction(1.5) < 1500  # [m] a moderate snowfall's visibility


# ---- how flakes move


def test_flakes_sway() -> None:
    info = clip(frames=40, speed_m_s=0.0)
    still = params(gust_m_s=0.0, wind_m_s=(0.0, 0.0, 0.0))
    moves = np.array([snow_arguments(still, info, i)["particle_move"][:, :3] for i in range(40)], dtype=np.float64)
    assert (moves[:, :, 1] > 0).all()  # down
    assert np.abs(moves.mean(axis=0)[:, 0]).max() < 0.5 * np.abs(moves[:, :, 0]).max()  # to and fro
    fixed = snow_arguments(params(flutter_m=0.0, gust_m_s=0.0, wind_m_s=(0.0, 0.0, 0.0)), info, 3)["particle_move"]
    assert not fixed[:, [0, 2]].any()


def test_sway_and_speed_belong_together() -> None:
    step = 1e-3
    info = clip(frames=3, step_s=step, speed_m_s=0.0, start_s=5.0)
    p = params(gust_m_s=0.0, wind_m_s=(0.0, 0.0, 0.0), exposure_s=step)
    first, now, last = (snow_arguments(p, info, i) for i in range(3))
    scale = now["particle_move"][:, 4].astype(np.float64)
    way = (last["particle_at"].astype(np.int64) - first["particle_at"]).T
    way = (way + 2**30) % 2**31 - 2**30  # the shorter way around the box
    metres = way * np.abs(now["particle_axes"].reshape(3, 3)).max(axis=1) * scale[:, None] * (1, -1, -1)
    assert np.allclose(metres / 2, 2 * now["particle_move"][:, :3] * scale[:, None], atol=1e-7)


def test_the_papers_flakes() -> None:
    p = SnowFallParams(convention="paper")
    given = snow_arguments(p, clip(speed_m_s=0.0), 1)
    assert given["particle_count"] == 6000
    half = given["particle_move"][:, :3] * given["particle_move"][:, 4:5] / (p.exposure_s / 2)
    assert np.allclose(half, (0.3, 2.0, -0.1), rtol=1e-5)  # (0.3, -2, 0.1) in the world


# ---- the picture


@cache
def usual() -> tuple[GBuffer, Scene, dict[str, np.ndarray]]:
    info = clip(speed_m_s=3.0)
    source, where = frame(info), scene(info, params(), lights=[*all_kinds(), *street_lamps(3)], haze=0.02)
    return source, where, reference(source, where, params())


def test_only_flakes_change() -> None:
    source, _, out = usual()
    still = out["flake_alpha"] == 0
    assert still.any()
    assert not still.all()
    assert np.array_equal(out["rgb"][still], source["rgb"][still])
    assert np.array_equal(out["flake_depth"][still], source["depth"][still])


def test_a_flake_near_the_camera_has_its_own_depth() -> None:
    info = clip(speed_m_s=0.0)
    far = frame(info, depth=np.full((54, 96), 50, dtype=np.float32))
    p = params(flakes=20_000, near_m=0.2)
    out = reference(far, scene(info, p), p)
    assert (out["flake_depth"] < 1).any()
    assert (out["flake_depth"] <= 50 * (1 + 1e-12)).all()


def test_flakes_are_white_before_dark_and_grey_before_white() -> None:
    info = clip(speed_m_s=0.0)
    planes = {"depth": np.full((54, 96), 50, dtype=np.float32)}
    grey = scene(info, params(), around=even(0.5), white_cd_m2=1.0)
    for ground, sign in ((0.1, 1), (0.9, -1)):
        source = frame(info, rgb=np.full((54, 96, 3), ground, dtype=np.float32), **planes)
        assert (sign * (reference(source, grey, params())["rgb"] - np.float32(ground)) >= -1e-9).all()


def test_out_of_focus_is_wider_and_as_much_in_all() -> None:
    info = clip(192, 108, speed_m_s=0.0)
    far = frame(info, depth=np.full((108, 192), 50, dtype=np.float32))
    sharp, soft = (
        reference(far, scene(info, p), p)["flake_alpha"]
        for p in (params(aperture_mm=a, near_m=1.0, exposure_s=0.0) for a in (0.0, 25.0))
    )
    assert (soft > 0).sum() > 1.5 * (sharp > 0).sum()
    assert soft.max() < sharp.max()
    assert soft.sum() == pytest.approx(sharp.sum(), rel=0.05)


# ---- kernels against the reference


def test_kernel_matches_reference(opencl_backend: OpenCLBackend) -> None:
    source, where, truth = usual()
    check(opencl_backend, source, where, params(), truth)


@cache
def printed() -> tuple[GBuffer, Scene, dict[str, np.ndarray]]:
    info, p = clip(), SnowFallParams(convention="paper", flakes=500)
    source, where = frame(info), scene(info, p)
    return source, where, reference(source, where, p)


def test_kernel_matches_reference_as_printed(opencl_device: OpenCLBackend) -> None:
    source, where, truth = printed()
    check(opencl_device, source, where, SnowFallParams(convention="paper", flakes=500), truth)


def test_frames_backwards_and_twice_are_bit_equal(opencl_backend: OpenCLBackend) -> None:
    info = clip(frames=4)

    def drawn(index: int) -> dict[str, np.ndarray]:
        return on(opencl_backend, frame(info, index), scene(info, params(), index), params())

    forwards, backwards = [drawn(i) for i in (0, 1, 2, 3)], [drawn(i) for i in (3, 2, 1, 0)]
    for one, other in zip(forwards, reversed(backwards), strict=True):
        assert all(np.array_equal(one[key], other[key]) for key in one)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"flakes": -1}, "flakes"), ({"rate_mm_h": 51.0}, "rate_mm_h"), ({"flutter_m": -0.1}, "flutter_m")],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        SnowFallParams(**wrong)


def test_no_snow_has_no_flakes() -> None:
    given = snow_arguments(params(rate_mm_h=0.0), clip(), 1)
    assert given["particle_count"] == 0
    assert given["particle_move"].shape == (CLASSES, 8)
