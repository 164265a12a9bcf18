"""Streaks of rain: sizes, speeds and rates, the picture of the reference, and every kernel against it."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import Light
from aw4d.params import RainStreaksParams
from aw4d.scene import Scene
from aw4d.world.falling import classes, eye_velocity, rain_arguments, view_box
from aw4d.world.sizes import drop_speed, rain_extinction, rain_sizes
from reference_numpy.capsules import CLASSES, UNITS, places
from tests.conftest import ROOT
from tests.falling_inputs import LEVEL, check, clip, even, frame, on, reference, scene
from tests.fog_inputs import all_kinds, street_lamps

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

# Gunn and Kinzer 1949, table 2: diameter [mm], terminal speed [m/s].
GUNN_KINZER = [
    (0.5, 2.06), (0.6, 2.47), (0.7, 2.87), (0.8, 3.27), (0.9, 3.67), (1.0, 4.03), (1.2, 4.64), (1.4, 5.17), (1.6, 5.65),
    (1.8, 6.09), (2.0, 6.49), (2.2, 6.90), (2.4, 7.27), (2.6, 7.57), (2.8, 7.82), (3.0, 8.06), (3.2, 8.26), (3.4, 8.44),
    (3.6, 8.60), (3.8, 8.72), (4.0, 8.83), (4.2, 8.92), (4.4, 8.98), (4.6, 9.03), (4.8, 9.07), (5.0, 9.09), (5.2, 9.12),
    (5.4, 9.14), (5.6, 9.16), (5.8, 9.17),
]  # fmt: skip


def params(**changes: Any) -> RainStreaksParams:
    return RainStreaksParams(**({"rate_mm_h": 25.0, "drops": 400} | changes))


# ---- what falls


def test_drops_fall_as_fast_as_was_measured() -> None:
    D, v = np.array(GUNN_KINZER).T
    assert np.abs(drop_speed(D) - v).max() <= 0.1


@pytest.mark.parametrize("rate", [0.5, 2.0, 25.0, 150.0])
def test_the_drops_add_up_to_the_rate(rate: float) -> None:
    sizes = rain_sizes(rate)
    volume = np.pi / 6 * (sizes.diameter_mm * 1e-3) ** 3
    assert (sizes.number * volume * sizes.speed).sum() * 1e3 * 3600 == pytest.approx(rate, rel=1e-9)
    slope = np.diff(np.log(sizes.number)) / np.diff(sizes.diameter_mm)
    assert np.allclose(slope, -4.1 * rate**-0.21)  # Marshall and Palmer 1948


@pytest.mark.parametrize("rate", [1.0, 10.0, 50.0])
def test_the_number_is_marshall_and_palmers(rate: float) -> None:
    sizes = rain_sizes(rate)
    N0 = sizes.number / np.exp(-4.1 * rate**-0.21 * sizes.diameter_mm) / np.diff(sizes.diameter_mm)[0]
    assert np.allclose(N0, 8000, rtol=0.15)  # their 8000 is off by so much


def test_more_rain_hides_more() -> None:
    assert rain_extinction(0.0) == 0
    assert 0 < rain_extinction(5.0) < rain_extinction(25.0) < 0.01


@pytest.mark.parametrize("most", [500, 20_000, 1_000_000])
def test_all_that_is_larger_to_the_eye_is_drawn(most: int) -> None:
    sizes, volume, reach = rain_sizes(25.0), 400.0, 10.0
    held = classes(sizes, most, reach, volume)
    assert held.count <= most
    angle = held.diameter / (held.scale * reach)
    assert np.allclose(angle[held.scale < 1], angle.min())
    # In the box of a drop of any size, that is `scale` times the longest reach, are as many as the distribution says.
    for low, high in ((0.5, 1.0), (1.0, 2.0), (2.0, 5.0)):
        inside = (held.diameter >= low * 1e-3) & (held.diameter < high * 1e-3)
        found = (held.count / CLASSES / (volume * held.scale[inside] ** 3)).sum()
        expected = sizes.number[(sizes.diameter_mm >= low) & (sizes.diameter_mm < high)].sum()
        assert found == pytest.approx(expected, rel=0.05)


def test_no_rain_has_no_drops() -> None:
    assert rain_arguments(params(rate_mm_h=0.0), clip(), 1)["particle_count"] == 0


# ---- where drops are


def world_places(p: RainStreaksParams, info: Any, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Places of all drops in the world [m], and what the box of each is, (N, 3)."""
    given = rain_arguments(p, info, index)
    axes = given["particle_axes"].astype(np.float64)
    kind, place = places(given["particle_count"], given["particle_at"], given["particle_corner"], axes, p.seed)
    scale = given["particle_move"][kind, 4].astype(np.float64)
    camera = info.camera(index)
    sides, _ = view_box(info, p.reach_m, index)
    world = (scale[:, None] * place) @ camera.camera_to_world[:3, :3].T + camera.camera_to_world[:3, 3]
    return world, sides * scale[:, None]


@pytest.mark.parametrize("start_s", [0.0, 1e6])
@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (-5e5, 100.0, 4e6)])
def test_drops_fall_on_from_frame_to_frame(start_s: float, origin: tuple[float, float, float]) -> None:
    p = params(gust_m_s=0.0, wind_m_s=(1.0, 0.0, -2.0))
    info = clip(start_s=start_s, origin=origin, frames=4)
    (before, box), (after, _) = world_places(p, info, 1), world_places(p, info, 2)
    diameter = rain_arguments(p, info, 1)["particle_move"][:, 3:5].astype(np.float64).prod(axis=1)[: len(before)]
    speed = drop_speed(diameter * 1e3)
    expected = np.stack([np.full_like(speed, 0.1), -0.1 * speed, np.full_like(speed, -0.2)], axis=1)
    off = (after - before - expected) / box
    assert np.abs(off - np.rint(off)).max() * box.max() < 5e-6  # whole boxes apart, but for rounding


def test_the_box_holds_the_view() -> None:
    info = clip(turn=LEVEL @ np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]]))
    sides, middle = view_box(info, 10.0, 1)
    assert (np.abs(middle) <= sides / 2).all()
    ray = info.camera(1).rays().reshape(-1, 3)
    ends = ray / np.linalg.norm(ray, axis=1, keepdims=True) @ info.camera(1).camera_to_world[:3, :3].T * 10
    assert (np.abs(ends - middle) <= sides / 2).all()


def test_places_fill_the_box_evenly() -> None:
    p = params(drops=50_000)
    given = rain_arguments(p, clip(), 1)
    flat = (np.eye(3) / UNITS).ravel()
    _, place = places(50_000, np.zeros((3, CLASSES), np.uint32), np.zeros(3, np.int32), flat, 1)
    assert given["particle_count"] == 50_000
    counts, _ = np.histogramdd(place, bins=(5, 5, 5), range=[(0, 1)] * 3)
    assert abs(counts - 400).max() < 5 * 20  # five standard deviations
    assert np.abs(np.corrcoef(place.T) - np.eye(3)).max() < 0.02


def test_the_eye_moves_with_the_poses() -> None:
    info = clip(speed_m_s=12.0)
    assert np.allclose(eye_velocity(info, 1), 12.0 * LEVEL[:, 2])
    assert np.allclose(eye_velocity(info, 0), 12.0 * LEVEL[:, 2])
    assert np.array_equal(eye_velocity(clip(frames=1), 0), np.zeros(3))


def test_streaks_slant_when_driving() -> None:
    def way(speed: float) -> np.ndarray:
        info = clip(speed_m_s=speed)
        return rain_arguments(params(gust_m_s=0.0, wind_m_s=(0.0, 0.0, 0.0)), info, 1)["particle_move"][:, :3]

    assert np.allclose(way(0.0)[:, [0, 2]], 0, atol=1e-9)
    assert (way(0.0)[:, 1] > 0).all()  # down
    assert np.allclose(way(10.0)[:, 1], way(0.0)[:, 1])
    assert (way(10.0)[:, 2] < 0).all()  # towards the eye


# ---- the picture


@cache
def usual() -> tuple[GBuffer, Scene, dict[str, np.ndarray]]:
    info = clip()
    source, where = frame(info), scene(info, params(), lights=[*all_kinds(), *street_lamps(3)], haze=0.02)
    return source, where, reference(source, where, params())


def test_only_streaks_change() -> None:
    source, _, out = usual()
    still = out["streak_alpha"] == 0
    assert still.any()
    assert not still.all()
    assert np.array_equal(out["rgb"][still], source["rgb"][still])
    assert np.array_equal(out["streak_depth"][still], source["depth"][still])


def test_a_standing_camera_sees_only_drops_move() -> None:
    info = clip(speed_m_s=0.0)
    planes = {name: frame(info)[name] for name in ("rgb", "depth", "sky")}
    first, second = (reference(frame(info, i, **planes), scene(info, params(), i), params()) for i in (0, 2))
    still = (first["streak_alpha"] == 0) & (second["streak_alpha"] == 0)
    assert np.array_equal(first["rgb"][still], second["rgb"][still])
    assert not np.array_equal(first["rgb"], second["rgb"])


def test_nothing_shows_behind_surfaces() -> None:
    info = clip()
    near = np.full((54, 96), 0.39, dtype=np.float32)
    source = frame(info, depth=near, sky=np.zeros((54, 96), dtype=bool))
    assert not reference(source, scene(info, params()), params())["streak_alpha"].any()


def test_drops_in_a_beam_light_up() -> None:
    info = clip()
    dark = frame(info, rgb=np.zeros((54, 96, 3), dtype=np.float32), depth=np.full((54, 96), 30, dtype=np.float32))
    lamp = Light(kind="point", position=(0.5, -0.5, 6.0), intensity=(50, 50, 50), r_max_m=20, frame="camera")
    night = reference(dark, scene(info, params(), around=even(0.0)), params())
    lit = reference(dark, scene(info, params(), around=even(0.0), lights=[lamp]), params())
    assert not night["rgb"].any()
    assert lit["rgb"].max() > 0
    assert np.array_equal(night["streak_alpha"], lit["streak_alpha"])


def test_as_bright_as_what_is_around_they_cannot_be_seen() -> None:
    info = clip()
    white = frame(info, rgb=np.ones((54, 96, 3), dtype=np.float32))
    out = reference(white, scene(info, params(), around=even(1.0), white_cd_m2=1.0), params())
    assert np.allclose(out["rgb"], 1.0, rtol=1e-6)
    assert out["streak_alpha"].max() > 0.01


def test_longer_exposure_is_fainter_and_as_much_in_all() -> None:
    info = clip(speed_m_s=0.0)
    far = frame(info, depth=np.full((54, 96), 50, dtype=np.float32))
    short, long = (
        reference(far, scene(info, p), p)["streak_alpha"]
        for p in (params(exposure_s=e, opacity=1.0, drops=4000) for e in (0.002, 0.006))
    )
    assert long.max() < short.max()
    assert long.sum() == pytest.approx(short.sum(), rel=0.05)


def test_the_papers_drops() -> None:
    p = RainStreaksParams(convention="paper", drops=3000)
    info = clip(frames=4)
    given = rain_arguments(p, info, 1)
    diameter = given["particle_move"][:, 3] * 1e3
    assert given["particle_count"] == 3000
    assert 0.5 <= diameter.min() < 0.51
    assert 5.99 < diameter.max() <= 6.0
    assert np.histogram(diameter, 5)[0].min() > 0.99 * CLASSES / 5
    half = np.linalg.norm(rain_arguments(p, clip(frames=4, speed_m_s=0.0), 1)["particle_move"][:, :3], axis=1)
    assert 2 * half.max() == pytest.approx(0.8 * 0.1 * 9.2, rel=0.05)
    assert given["particle_taper"] == pytest.approx(1 / 0.7)
    assert p.opacity == 0.4


# ---- kernels against the reference


def test_kernel_matches_reference(opencl_backend: OpenCLBackend) -> None:
    source, where, truth = usual()
    check(opencl_backend, source, where, params(), truth)


@cache
def printed() -> tuple[GBuffer, Scene, dict[str, np.ndarray]]:
    info, p = clip(), RainStreaksParams(convention="paper", drops=20_000)
    source, where = frame(info), scene(info, p)
    return source, where, reference(source, where, p)


def test_kernel_matches_reference_as_printed(opencl_backend: OpenCLBackend) -> None:
    source, where, truth = printed()
    check(opencl_backend, source, where, RainStreaksParams(convention="paper", drops=20_000), truth)


def test_the_same_frame_twice_and_from_another_process_is_bit_equal(opencl_device: OpenCLBackend) -> None:
    source, where, _ = usual()
    first = on(opencl_device, source, where, params())
    assert all(np.array_equal(values, first[key]) for key, values in on(opencl_device, source, where, params()).items())
    code = (
        "import sys, hashlib\nfrom aw4d.backend_opencl import OpenCLBackend\nfrom tests import test_rain_streaks as t\n"
        "s, w, _ = t.usual()\nout = t.on(OpenCLBackend(*map(int, sys.argv[1:])), s, w, t.params())\n"
        "print(hashlib.sha256(b''.join(out[k].tobytes() for k in sorted(out))).hexdigest())"
    )
    import hashlib

    here = hashlib.sha256(b"".join(first[k].tobytes() for k in sorted(first))).hexdigest()
    command = [sys.executable, "-c", code, str(opencl_device.report.index), str(opencl_device.width)]
    there = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()[-1]
    assert there == here


@pytest.mark.parametrize(
    ("wrong", "named"),
    [({"drops": -1}, "drops"), ({"drops": 2_000_000}, "drops"), ({"near_m": 0.0}, "near_m"), ({"g": 1.0}, "g")],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        RainStreaksParams(**wrong)
