"""Ripples: rings on puddles, anchored to the world, functions of time; and every kernel against the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d import street
from aw4d.backend_numpy import NumpyBackend
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.params import RipplesParams
from aw4d.params.ground import big_drops
from aw4d.world.anchor import TICKS
from reference_numpy.ripples import drops, footprint, rings, train
from tests.ground_inputs import FAR, SIZES, check, frame, pose, reference, run, scene, unchanged, wall
from tests.lit_inputs import unchecked

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

SETTINGS = {
    "default": RipplesParams(),
    "heavy": RipplesParams(rate_mm_h=50, sets=4),
    "light": RipplesParams(rate_mm_h=1),
    "small": RipplesParams(cell_m=0.25, life_s=0.5, wave_rad_m=124, train_m=0.15),
    "paper": RipplesParams(convention="paper"),
}
SIZE = (54, 96)
OF_RINGS = ("life_bits", "sets", "chance", "low", "high", "wave", "steepness", "seed")


def level(source: GBuffer) -> GBuffer:
    """The frame under level water, or where a puddle ends, everywhere."""
    up = source.camera.camera_to_world[1, :3].astype(np.float32)
    return source.with_plane("normal", np.broadcast_to(up, source["normal"].shape).copy())


def puddle(source: GBuffer, seed: int = 5) -> np.ndarray:
    """Water on two thirds of the road, of any depth."""
    drawn = np.random.default_rng(seed).random(source.camera.shape, dtype=np.float32)
    return np.where(source["road"], np.clip(3 * drawn - 1, 0, 1), 0).astype(np.float32)


def field(x: np.ndarray, z: np.ndarray, tick: int, p: RipplesParams) -> tuple[np.ndarray, ...]:
    """Height times k, and slopes, at places [cells] of a lake."""
    a = p.arguments()
    column, row = np.floor(x), np.floor(z)
    given = {name: a[name] for name in OF_RINGS}
    return rings(column.astype(np.int64), row.astype(np.int64), x - column, z - row, tick=tick, **given)


def lake(count: int = 60_000, seed: int = 4) -> tuple[np.ndarray, np.ndarray]:
    x, z = np.random.default_rng(seed).uniform(-200, 200, (2, count))
    return x, z


@pytest.mark.parametrize("name", SETTINGS)
def test_dry_ground_stays_still(opencl_device: OpenCLBackend, name: str) -> None:
    source = frame()
    for backend in (NumpyBackend(), opencl_device):
        found = run(backend, "ripples", source, SETTINGS[name], puddle=np.zeros(SIZE, np.float32))
        assert unchanged(found, source, ["normal", "roughness"])
        assert (found["ripple"] == 0.5).all()


def test_no_rain_no_rings(opencl_device: OpenCLBackend) -> None:
    source = frame()
    for backend in (NumpyBackend(), opencl_device):
        found = run(backend, "ripples", source, RipplesParams(rate_mm_h=0), puddle=puddle(source))
        assert unchanged(found, source, ["normal", "roughness"])


def test_normals_stay_unit_and_bend_as_the_slope_does() -> None:
    source = level(wall(4.5))
    p = RipplesParams(low=0.15)
    found = reference("ripples", source, p, puddle=np.ones((100, 100), np.float32))
    assert np.allclose(np.linalg.norm(found["normal"], axis=-1), 1)
    slope = np.tan(np.arccos(np.clip(found["normal"] @ source.camera.camera_to_world[1, :3], -1, 1)))
    assert 0.03 < slope.max() < 4 * 0.15  # of several rings at once


@pytest.mark.parametrize("name", SETTINGS)
def test_the_slope_is_the_gradient_of_the_height(name: str) -> None:
    p, step = SETTINGS[name], 1e-5
    x, z = lake(3000)
    _, along_x, along_z = field(x, z, 4000, p)
    k = p.arguments()["wave"] * np.pi / 2
    for found, dx, dz in ((along_x, step, 0.0), (along_z, 0.0, step)):
        rise = (field(x + dx, z + dz, 4000, p)[0] - field(x - dx, z - dz, 4000, p)[0]) / (2 * step * k)
        assert np.quantile(np.abs(rise - found), 0.999) < 1e-4 * np.abs(found).max()


@pytest.mark.parametrize("name", SETTINGS)
def test_rings_cross_cells_without_a_seam(name: str) -> None:
    """Either side of borders between cells, where another nine cells are asked."""
    along = np.random.default_rng(2).uniform(-50, 50, 20_000)
    border = np.random.default_rng(3).integers(-50, 50, 20_000).astype(np.float64)
    for x, z in ((border, along), (along, border)):
        side = 1e-9 * (x == border), 1e-9 * (z == border)
        over, under = (field(x + s * side[0], z + s * side[1], 77, SETTINGS[name]) for s in (1, -1))
        for a, b in zip(over, under, strict=True):
            assert np.abs(a - b).max() < 1e-6


@pytest.mark.parametrize("name", SETTINGS)
def test_rings_come_and_go_without_a_jump(name: str) -> None:
    """From tick to tick, through many births and deaths, no height moves by more than waves do."""
    p = SETTINGS[name]
    x, z = lake(4000)
    heights = np.array([field(x, z, tick, p)[0] for tick in range(-20, 20)])
    k, a_tick = p.arguments()["wave"] * np.pi / 2, 2.0 ** -p.arguments()["life_bits"]
    assert np.abs(np.diff(heights, axis=0)).max() < 8 * p.high * k * a_tick


def test_a_ring_ends_where_the_nine_cells_do() -> None:
    """A drop's ring reaches one cell, at the end of its life, when nothing is left of it."""
    lift, slope = train(np.linspace(-1, 0, 100), 10.0, 1.7)
    assert not lift.any()
    assert not slope.any()


@pytest.mark.parametrize("name", ["default", "heavy", "light", "small"])
def test_the_variance_is_that_of_the_rings(name: str) -> None:
    p = SETTINGS[name]
    slopes = [s for tick in range(0, 40_000, 4_003) for s in field(*lake(seed=tick), tick, p)[1:]]
    assert np.mean(np.square(slopes)) * p.strength**2 == pytest.approx(p.arguments()["variance"], rel=0.05)


def test_drops_fall_as_often_as_it_rains() -> None:
    """Marshall and Palmer's drops of more than 3 mm, summed by their fall speeds, one by one."""
    D = np.linspace(3, 20, 100_001)
    for rate in (1.0, 6.0, 25.0, 100.0):
        flux = 8000 * np.exp(-4.1 * rate**-0.21 * D) * (9.65 - 10.3 * np.exp(-0.6 * D))
        assert big_drops(rate) == pytest.approx(np.trapezoid(flux, D), rel=1e-3)
    x, z = np.meshgrid(np.arange(300), np.arange(300))
    p = RipplesParams(rate_mm_h=3).arguments()
    fell = [drops(x, z, tick=0, life_bits=p["life_bits"], seed=n)[3] < p["chance"] for n in range(p["sets"])]
    a_life = sum(f.sum() for f in fell) / (300 * 300 * 0.5**2)
    assert a_life == pytest.approx(big_drops(3.0) * 1.0, rel=0.03)


def test_far_ripples_become_roughness() -> None:
    source = level(wall(4.5, count=20))
    full = np.ones((20, 20), np.float32)
    p = RipplesParams()
    variance = p.arguments()["variance"]
    for depth, near in ((0.2, True), (5000.0, False)):
        at = source.with_plane("depth", np.full((20, 20), depth, np.float32))
        found = reference("ripples", at, p, puddle=full)
        r = source["roughness"].astype(np.float64)
        if near:
            assert np.allclose(found["roughness"], r, atol=1e-3)
        else:
            assert np.allclose(found["normal"], source["normal"], atol=1e-7)
            assert np.allclose(found["roughness"], (r**4 + 2 * variance) ** 0.25)


def test_the_footprint_is_what_a_pixel_sees() -> None:
    """From one pixel's ray to the next one's, on level ground straight ahead."""
    at = pose(yaw=0.0, pitch=0.2)
    source = frame(601, 601, at=at)
    K = source.camera.K
    view = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    seen = footprint((601, 601), source["depth"].astype(np.float64), at[1, :3], **view)[:, 300]
    world = (source.camera.rays()[:, 300] * source["depth"][:, 300:301]) @ at[:3, :3].T
    step = np.abs(np.gradient(world[:, 2]))
    ground = source["road"][:, 300] & (seen < 1)
    assert ground.sum() > 100
    assert np.allclose(seen[ground], step[ground], rtol=0.02)


# ---- anchored to the world, and functions of time


@pytest.mark.parametrize("name", [name for name in SETTINGS if name != "paper"])
@pytest.mark.parametrize("origin", [(0, 0, 0), FAR])
def test_a_ring_is_where_it_is_from_wherever_it_is_seen(
    opencl_device: OpenCLBackend, name: str, origin: tuple[float, float, float]
) -> None:
    """10,000 points from 4.5 m and from 1.5 m."""
    seen = []
    for ahead in (0.0, 3.0):
        source = wall(4.5, focal=60.0, ahead=ahead)
        where = scene(source, 2.34, origin)
        full = np.ones((100, 100), np.float32)
        seen.append(run(opencl_device, "ripples", source, SETTINGS[name], where, puddle=full)["ripple"])
    assert np.abs(seen[0] - seen[1]).max() < 1e-4
    assert np.ptp(seen[0]) > 0.005


def test_printed_cells_stick_to_the_screen() -> None:
    """Cells of pixels are the same whatever the camera sees: they swim on the road."""
    p = SETTINGS["paper"]
    full = np.ones((100, 100), np.float32)
    seen = [reference("ripples", wall(4.5, ahead=ahead), p, puddle=full)["ripple"] for ahead in (0.0, 3.0)]
    assert np.array_equal(*seen)


@pytest.mark.parametrize("name", SETTINGS)
def test_any_time_in_any_order(opencl_device: OpenCLBackend, name: str) -> None:
    source = level(frame())
    times = [0.0, 1 / 3, 2.5, 1e6, -7.0]

    def at(t: float) -> Any:
        return run(opencl_device, "ripples", source, SETTINGS[name], scene(source, t), puddle=puddle(source))

    forwards = [at(t) for t in times]
    backwards = [at(t) for t in reversed(times)][::-1]
    for a, b in zip(forwards, backwards, strict=True):
        assert all(np.array_equal(a[key], b[key]) for key in a)
    assert all((forwards[0]["ripple"] != other["ripple"]).any() for other in forwards[1:])
    assert all(np.array_equal(forwards[0]["roughness"], other["roughness"]) for other in forwards[1:])


def test_a_clip_may_run_for_days() -> None:
    """2^32 ticks are 12 days: afterwards the rain repeats, without a jump."""
    p = RipplesParams()
    x, z = lake(1000)
    whole = 2**32 / TICKS
    for t in (0.0, 0.5, 17.25):
        a, b = (field(x, z, round(s * TICKS) & 0xFFFFFFFF, p)[0] for s in (t, t + whole))
        assert np.array_equal(a, b)


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("time", [0.0, 3.3, 1e6])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str, time: float) -> None:
    source = frame()
    check(opencl_backend, "ripples", source, SETTINGS[name], scene(source, time, FAR), puddle=puddle(source))


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    source = frame(*size)
    check(opencl_backend, "ripples", source, RipplesParams(), puddle=puddle(source))


@pytest.mark.parametrize("name", SETTINGS)
def test_street(opencl_device: OpenCLBackend, name: str) -> None:
    source = level(street.frame(28, width=320, height=176))
    water = np.where(source["road"], 1, 0).astype(np.float32)
    check(opencl_device, "ripples", source, SETTINGS[name], scene(source, 1.7), puddle=water)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 2.0, -3.0])
@pytest.mark.parametrize("place", [(-79.99, 80.0), (0.0, -1e-4), (-1e5, 3e5)])
def test_places(opencl_device: OpenCLBackend, yaw: float, place: tuple[float, float]) -> None:
    """Corners of blocks, negative coordinates, a camera that is upside down."""
    at = pose(*place, yaw=yaw)
    for turned in (1, -1):
        at[:3, :2] *= turned
        source = frame(at=at)
        check(opencl_device, "ripples", source, RipplesParams(), puddle=puddle(source))


@pytest.mark.parametrize("name", ["default", "paper"])
@pytest.mark.parametrize(
    ("plane", "value"),
    [("normal", 0.0), ("normal", 1.0), ("roughness", 0.0), ("roughness", 1.0), ("depth", 1e-3), ("depth", 1e4)],
)
def test_hard_surfaces(opencl_device: OpenCLBackend, name: str, plane: str, value: float) -> None:
    source = frame()
    hard = unchecked(source, **{plane: np.full_like(source[plane], value)})
    last_digit = {"normal": 2.0**-24 * np.abs(hard["normal"]).astype(np.float64)}  # a component may pass through 0
    check(opencl_device, "ripples", hard, SETTINGS[name], inherent=last_digit, puddle=puddle(source))


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"rate_mm_h": -1.0}, "rate_mm_h"),
        ({"cell_m": 0.3}, "cell_m"),
        ({"life_s": 0.7}, "life_s"),
        ({"low": 0.2, "high": 0.1}, "low"),
        ({"sets": 0}, "sets"),
        ({"convention": "literal"}, "convention"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        RipplesParams(**wrong)
