"""What all that falls shares: order, brightness at any resolution, blending, and the hard cases of every kernel."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aw4d.backend import frame_arguments, own_arguments
from aw4d.backend_numpy import NumpyBackend
from aw4d.clip import ClipInfo
from aw4d.gbuffer import GBuffer
from aw4d.params import RainStreaksParams, SnowFallParams
from aw4d.scene import Scene
from reference_numpy.blending import blend, in_order
from reference_numpy.capsules import CLASSES, Capsules, capsules, in_front, places
from tests.falling_inputs import LEVEL, NAMES, Params, check, clip, even, frame, on, reference, scene
from tests.fog_inputs import all_kinds

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

SIZES = [(1, 1), (1, 9), (9, 1), (13, 7), (15, 3), (16, 16), (17, 17), (31, 2), (33, 40), (129, 70)]


def rain(**changes: Any) -> RainStreaksParams:
    return RainStreaksParams(**({"rate_mm_h": 25.0, "drops": 400} | changes))


def snow(**changes: Any) -> SnowFallParams:
    return SnowFallParams(**({"rate_mm_h": 4.0, "flakes": 300} | changes))


def every(source: GBuffer, where: Scene, p: Params) -> tuple[Capsules, float]:
    """All particles, and the steps of depth a metre by which they are put in order."""
    given = own_arguments(NAMES[type(p)], {**frame_arguments(source, where), **p.arguments()})
    box = (np.asarray(given[f"particle_{name}"]) for name in ("at", "corner", "axes"))
    kind, place = places(given["particle_count"], *box, p.seed)
    own = ("fx", "fy", "cx", "cy", "near_m", "reach_m", "opacity", "aperture_mm", "focus_m", "convention")
    found = capsules(
        kind,
        place,
        move=given["particle_move"].astype(np.float64),
        taper=given["particle_taper"],
        **{name: given[name] if name == "convention" else float(given[name]) for name in own},
    )
    return found, given["particle_steps"]


def drawn(backend: OpenCLBackend, count: int) -> NDArray[np.int64]:
    """Numbers of the particles that the last run drew, in their order, of as many."""
    number, order = np.empty(1, dtype=np.int32), np.empty(max(count, 1), dtype=np.uint32)
    backend._cl.enqueue_copy(backend._queue, number, backend._pool["particle_shown"])
    backend._cl.enqueue_copy(backend._queue, order, backend._pool["particle_order"])
    return order[: number[0]].astype(np.int64)


def check_order(backend: OpenCLBackend, info: ClipInfo, p: Params) -> None:
    """All that show are drawn, and others only if they come within a pixel of the picture, the nearest first."""
    source, where = frame(info), scene(info, p)
    on(backend, source, where, p, layers=False)
    drops, steps = every(source, where, p)
    mine = drawn(backend, len(drops.depth))
    by_number = np.sort(mine)
    assert np.array_equal(mine, by_number[in_order(drops.depth[by_number], steps)])
    assert np.isin(np.nonzero(in_front(drops, info.width, info.height))[0], mine).all()
    kept = drops.take(mine)
    wide = np.maximum(kept.head_radius, kept.tail_radius)[:, None]
    assert (np.maximum(kept.head, kept.tail) + wide > -1).all()
    assert (np.minimum(kept.head, kept.tail) - wide < (info.width, info.height)).all()


def one(length: float, radius: float, at: tuple[float, float], tilt: float, focal: float = 100.0) -> Capsules:
    """A drop 1 m away that is `radius` px large and passes over `length` px of the picture."""
    move = np.zeros((CLASSES, 8))
    move[:, :5] = np.cos(tilt) * length / 2 / focal, np.sin(tilt) * length / 2 / focal, 0, 2 * radius / focal, 1
    place = np.array([[at[0] / focal, at[1] / focal, 1.0]])
    settings = {"near_m": 0.1, "reach_m": 1e3, "opacity": 1.0, "aperture_mm": 0.0, "focus_m": 10.0}
    lens = {"fx": focal, "fy": focal, "cx": 0.0, "cy": 0.0}
    return capsules(np.array([0]), place, move=move, taper=1.0, convention="physical", **lens, **settings)


def opacity_of(drops: Capsules, size: int = 64) -> float:
    """Sum over a picture."""
    far, sky = np.full((size, size), 50.0), np.ones((size, size), dtype=bool)
    _, alpha, _ = blend(drops, np.ones((1, 3)), rgb=np.zeros((size, size, 3)), depth=far, sky=sky)
    return float(alpha.sum())


# ---- the reference


@pytest.mark.parametrize("radius", [0.004, 0.1, 0.7, 3.0, 6.0])
@pytest.mark.parametrize("length", [0.0, 1e-6, 2.0, 25.0])
def test_a_particle_hides_its_disc_for_as_long_as_it_takes(radius: float, length: float) -> None:
    rng = np.random.default_rng(0)
    sums = [
        opacity_of(one(length, radius, (30 + x, 31 + y), tilt)) for x, y, tilt in rng.uniform(0, 1, (60, 3)) * (1, 1, 7)
    ]
    assert np.mean(sums) == pytest.approx(np.pi * radius**2, rel=0.01)


def test_a_particle_at_rest_is_round() -> None:
    still = one(0.0, 4.0, (32.0, 32.0), 0.0)
    _, alpha, nearest = blend(
        still, np.ones((1, 3)), rgb=np.zeros((64, 64, 3)), depth=np.full((64, 64), 9.0), sky=np.zeros((64, 64), bool)
    )
    assert np.allclose(alpha, alpha.T)
    assert np.allclose(alpha[1:], alpha[:0:-1])
    assert 0.85 < alpha[32, 32] <= 1
    assert nearest[32, 32] == pytest.approx(1.0)
    assert nearest[32, 40] == 9.0


def test_what_is_nearer_hides_what_is_farther() -> None:
    both = [one(0.0, 4.0, (32.0, 32.0), 0.0), one(0.0, 4.0, (32.0, 32.0), 0.0)]
    together = Capsules(**{k: np.concatenate([getattr(c, k) for c in both]) for k in vars(both[0])})
    colors = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    planes = {"rgb": np.zeros((64, 64, 3)), "depth": np.full((64, 64), 9.0), "sky": np.zeros((64, 64), bool)}
    light, _, _ = blend(together, colors, **planes)
    assert light[32, 32, 0] > 5 * light[32, 32, 1] > 0


def test_numbers_of_particles_do_not_matter() -> None:
    rng = np.random.default_rng(3)
    drops = [one(9.0, 1.5, tuple(at), 1.0) for at in rng.uniform(0, 64, (40, 2))]
    together = Capsules(**{k: np.concatenate([getattr(c, k) for c in drops]) for k in vars(drops[0])})
    together.depth = rng.uniform(1, 2, 40).astype(np.float32)
    color, shuffled = rng.random((40, 3)), rng.permutation(40)
    planes = {"rgb": rng.random((64, 64, 3)), "depth": np.full((64, 64), 9.0), "sky": np.zeros((64, 64), bool)}

    def picture(numbers: NDArray[np.int64]) -> np.ndarray:
        held = together.take(numbers)
        order = in_order(held.depth, 2**16 / 10.0)
        return blend(held.take(order), color[numbers][order], **planes)[0]

    assert np.array_equal(picture(np.arange(40)), picture(shuffled))


def test_a_particle_sinks_into_a_surface() -> None:
    def seen(surface: float) -> float:
        size = (64, 64)
        drops = one(0.0, 4.0, (32.0, 32.0), 0.0)
        return blend(
            drops, np.ones((1, 3)), rgb=np.zeros((*size, 3)), depth=np.full(size, surface), sky=np.zeros(size, bool)
        )[1].sum()

    assert seen(1.0) == seen(0.5) == 0
    assert 0 < seen(1.005) < seen(1.009) < seen(1.02) == seen(1e5)


# ---- kernels


@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 5000])
def test_sorting_is_a_stable_sort_by_depth(opencl_backend: OpenCLBackend, count: int) -> None:
    check_order(opencl_backend, clip(33, 20), rain(drops=count))


@pytest.mark.parametrize("seed", range(12))
def test_what_is_passed_over_roughly_does_not_show(opencl_device: OpenCLBackend, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = LEVEL @ Rotation.random(random_state=seed).as_matrix()
    info = clip(33, 20, turn=turn, focal=float(np.exp(rng.uniform(-2, 3))), speed_m_s=float(rng.uniform(0, 40)))
    K = info.K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]]) * rng.normal(0, 40, (3, 1))  # as of a crop
    lens = {"aperture_mm": float(rng.uniform(0, 60)), "focus_m": float(rng.uniform(0.2, 20)), "near_m": 0.02}
    exposure = float(rng.choice([0.0, 0.004, 0.1]))
    for p in (rain(drops=20_000, exposure_s=exposure, **lens), snow(flakes=20_000, exposure_s=exposure, **lens)):
        check_order(opencl_device, replace(info, K=K), p)


def test_brightness_does_not_depend_on_the_resolution(opencl_device: OpenCLBackend) -> None:
    added = []
    for width in (640, 1280, 2560):
        info, p = clip(width, width // 4), rain(drops=100_000, rate_mm_h=50.0)
        size = (info.height, width)
        black = frame(
            info, rgb=np.zeros((*size, 3), np.float32), depth=np.full(size, 90, np.float32), sky=np.zeros(size, bool)
        )
        where = scene(info, p, around=even(1.0), white_cd_m2=1.0)
        added.append(on(opencl_device, black, where, p, layers=False)["rgb"].mean())
    assert min(added) > 0.005
    assert max(added) < 1.02 * min(added)


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    info = clip(*size)
    check(opencl_backend, frame(info), scene(info, rain(), lights=all_kinds()), rain())


TURNS = {
    "rolled": np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]]),
    "looks down": np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]),
    "looks up": np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]),
    "upside down": np.diag([-1.0, -1.0, 1.0]),
}


@pytest.mark.parametrize("turn", TURNS)
def test_any_camera(opencl_device: OpenCLBackend, turn: str) -> None:
    info = clip(turn=LEVEL @ TURNS[turn])
    source, where = frame(info), scene(info, rain())
    truth = reference(source, where, rain())
    assert truth["streak_alpha"].any()
    check(opencl_device, source, where, rain(), truth)


CLIPS: dict[str, dict[str, Any]] = {
    "a million seconds": {"start_s": 1e6},
    "far from the origin": {"origin": (-4e6, 0.0, 5e5)},
    "one frame": {"frames": 1},
    "two frames at all but one time": {"frames": 2, "step_s": 1e-9, "speed_m_s": 0.0},
    "a fast car": {"speed_m_s": 60.0},
    "a telephoto lens": {"focal": 30.0},
    "a wide lens": {"focal": 0.2},
}


@pytest.mark.parametrize("kind", CLIPS)
@pytest.mark.parametrize("p", [rain(), snow()], ids=["rain", "snow"])
def test_any_clip(opencl_device: OpenCLBackend, kind: str, p: Params) -> None:
    info = clip(**CLIPS[kind])
    index = len(info) - 1
    check(opencl_device, frame(info, index), scene(info, p, index), p)


HARD: dict[str, Params] = {
    "none": rain(drops=0),
    "one": rain(drops=1),
    "no rain": rain(rate_mm_h=0.0),
    "at rest": rain(exposure_s=0.0),
    "a second": rain(exposure_s=1.0),
    "into the lens": rain(near_m=0.01, exposure_s=0.2, drops=4000),
    "larger than tiles": snow(near_m=0.02, flakes=3000, aperture_mm=30.0, focus_m=0.5),
    "under a hundredth of a pixel": rain(reach_m=1e3, near_m=50.0, rate_mm_h=0.5, drops=4000),
    "opaque": rain(opacity=100.0),
    "straight on": rain(g=0.999),
    "straight back": rain(g=-0.999),
    "even": rain(g=0.0),
    "all alike": rain(wind_m_s=(0.0, 0.0, 0.0), gust_m_s=0.0),
    "a storm": rain(wind_m_s=(30.0, 0.0, 30.0)),
    "no blur": snow(aperture_mm=0.0),
    "wide box": snow(reach_m=200.0),
}


@pytest.mark.parametrize("kind", HARD)
def test_hard_particles(opencl_device: OpenCLBackend, kind: str) -> None:
    info, p = clip(), HARD[kind]
    check(opencl_device, frame(info), scene(info, p, lights=all_kinds(), haze=0.05), p)


@pytest.mark.parametrize("depth", [1e-3, 0.4, 5.0, 1e5])
def test_surfaces_at_one_depth(opencl_device: OpenCLBackend, depth: float) -> None:
    info = clip()
    flat = np.full((54, 96), depth, dtype=np.float32)
    for sky in (np.zeros((54, 96), dtype=bool), np.ones((54, 96), dtype=bool)):
        check(opencl_device, frame(info, depth=flat, sky=sky), scene(info, rain()), rain())


@pytest.mark.parametrize("ulps", [-1, 0, 1])
def test_a_surface_at_the_particles_own_depth(opencl_device: OpenCLBackend, ulps: int) -> None:
    info, p = clip(), rain()
    where = scene(info, p)
    drops, _ = every(frame(info), where, p)
    depth = np.resize(drops.depth[in_front(drops, 96, 54)], (54, 96))
    for _ in range(abs(ulps)):
        depth = np.nextafter(depth, np.float32(9e9 * ulps))
    check(opencl_device, frame(info, depth=depth, sky=np.zeros((54, 96), dtype=bool)), where, p)


@pytest.mark.parametrize("radiance", [0.0, 1e-30, 1e5])
def test_radiance(opencl_device: OpenCLBackend, radiance: float) -> None:
    info = clip()
    source = frame(info, rgb=np.full((54, 96, 3), radiance, dtype=np.float32))
    check(opencl_device, source, scene(info, rain()), rain())


@pytest.mark.parametrize("haze", [1e-8, 1.0, 10.0])
def test_haze(opencl_device: OpenCLBackend, haze: float) -> None:
    info = clip()
    check(opencl_device, frame(info), scene(info, rain(), haze=haze), rain())


def test_thick_haze_is_all_that_is_seen() -> None:
    info, p = clip(), rain()
    black = frame(info, rgb=np.zeros((54, 96, 3), dtype=np.float32))
    out = reference(black, scene(info, p, haze=1e3, haze_color=(0.2, 0.3, 0.4)), p)
    assert np.allclose(out["rgb"], out["streak_alpha"][..., None] * np.float32([0.2, 0.3, 0.4]))


@pytest.mark.parametrize("size", [(1, 1), (16, 16)])
def test_a_million_in_one_pixel_and_in_one_tile(opencl_device: OpenCLBackend, size: tuple[int, int]) -> None:
    info, p = clip(*size), rain(drops=1_000_000, rate_mm_h=150.0)
    source, where = frame(info), scene(info, p)
    assert where.world["rain_streaks.particle_count"] > 900_000
    out = on(opencl_device, source, where, p)
    assert all(np.isfinite(values).all() and (values >= 0).all() for values in out.values())
    assert 0 < out["streak_alpha"].mean() <= 1
    again = on(opencl_device, source, where, p)
    assert all(np.array_equal(values, again[key]) for key, values in out.items())


def test_pixels_without_particles_keep_their_bits(opencl_backend: OpenCLBackend) -> None:
    info = clip()
    source = frame(info)
    out = on(opencl_backend, source, scene(info, rain()), rain())
    still = out["streak_alpha"] == 0
    assert still.any()
    assert np.array_equal(out["rgb"][still], source["rgb"][still])
    assert np.array_equal(out["streak_depth"][still], source["depth"][still])


def test_both_at_once(opencl_device: OpenCLBackend) -> None:
    info = clip()
    source, rainy, snowy = frame(info), scene(info, rain()), scene(info, snow())
    both = replace(rainy, world={**rainy.world, **snowy.world})
    planes, exact = opencl_device.upload(source, both), NumpyBackend().upload(source, both)
    for name, p in (("snow_fall", snow()), ("rain_streaks", rain())):
        opencl_device.run(name, planes, p)
        NumpyBackend().run(name, exact, p)
    found = opencl_device.download(planes, ["rgb"])["rgb"]
    assert np.allclose(found, exact.arrays["rgb"], rtol=1e-5, atol=1e-6)
