"""Snow that lies: how much, where, and that it stays on its surfaces; and every kernel against the reference."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import street
from aw4d.camera import Camera
from aw4d.compare import BAR_P9999, error
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.params import SnowCoverParams
from reference_numpy import snow_cover as snow
from reference_numpy.world import BLOCK
from tests.cover_inputs import RESULTS, box, check, driving, frame, info, looking, on, reference, scene
from tests.grade_inputs import SIZES

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

Array = NDArray[np.float64]

SETTINGS = {
    "default": SnowCoverParams(),
    "deep": SnowCoverParams(depth_cm=60, displacement=True),
    "dusting": SnowCoverParams(depth_cm=0.2, gamma=1.0),
    "paper": SnowCoverParams(convention="paper"),
    "no ruts": SnowCoverParams(track_share=1, track_middle=1, road_bare=0, road_share=1),
}
ORIGINS = [(0.0, 0.0, 0.0), (5e5, 0.0, -5e5), (-4e6 - 0.37, 12.0, 4e6 + 0.11)]


def surface(normals: Array, *, depth: Array | float = 10.0, **planes: Any) -> GBuffer:
    """One row of dark, metallic surfaces in front of a level camera, with these normals in the world's axes."""
    count = len(normals)
    drawn = {
        "depth": np.broadcast_to(np.float32(depth), (1, count)).copy(),
        "normal": (normals @ looking()[:3, :3]).astype(np.float32)[None],
        "albedo": np.full((1, count, 3), 0.1, np.float32),
        "roughness": np.full((1, count), 0.9, np.float32),
        "metallic": np.ones((1, count), np.float32),
        "sky": np.zeros((1, count), bool),
        "road": np.zeros((1, count), bool),
        "vehicle": np.zeros((1, count), np.int32),
    }
    return GBuffer(drawn | planes, camera=frame(count, 1).camera, time=0.0)


def covered(source: GBuffer, p: SnowCoverParams) -> Array:
    clip = info([looking()], camera=source.camera)
    return reference(source, scene(clip, 0, p), p)["snow_coverage"]


def level(count: int = 400, **planes: Any) -> GBuffer:
    return surface(np.tile([0.0, 1.0, 0.0], (count, 1)), **planes)


def sloped(degrees: Array) -> GBuffer:
    angle = np.radians(degrees)
    return surface(np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=-1))


def height(x: Array, z: Array, block: tuple[int, int] = (0, 0)) -> Array:
    """For a depth of 1 m."""
    sums, *_ = snow.metaballs(x, z, block)
    return np.tensordot(snow._amplitudes(False), sums, 1)


# ---- how much


def test_no_snow_changes_nothing() -> None:
    source = frame()
    p = SnowCoverParams(depth_cm=0)
    found = reference(source, scene(driving(source=source), 0, p), p)
    assert not found["snow_coverage"].any()
    assert not found["snow_height"].any()
    for name in ("albedo", "normal", "roughness", "metallic", "depth"):
        assert np.array_equal(found[name], source[name].astype(np.float64)), name


@pytest.mark.parametrize("road", [False, True], ids=["ground", "road"])
def test_more_snow_covers_more_everywhere(road: bool) -> None:
    source = level(road=np.full((1, 400), road))
    depths = [0, 1e-6, 0.01, 0.1, 0.5, 1, 2, 4, 8]
    shares = np.array([covered(source, SnowCoverParams(depth_cm=depth))[0] for depth in depths])
    assert (np.diff(shares, axis=0) > 0).all()
    assert (covered(source, SnowCoverParams(depth_cm=200)) > (0.3 if road else 0.999)).all()


def test_mean_height_on_level_ground_is_the_depth() -> None:
    rng = np.random.default_rng(0)
    x, z = rng.uniform(-300, 300, (2, 40_000))
    assert height(x, z).mean() == pytest.approx(1, abs=0.01)
    source, p = level(5_000, depth=rng.uniform(50, 300, (1, 5_000)).astype(np.float32)), SnowCoverParams(depth_cm=7)
    found = reference(source, scene(info([looking()], camera=source.camera), 0, p), p)["snow_height"]
    assert found.mean() == pytest.approx(0.07, rel=0.02)


def test_steep_surfaces_and_undersides_stay_bare() -> None:
    angles = np.linspace(0, 180, 721)
    share = covered(sloped(angles), SnowCoverParams(depth_cm=50))[0]
    assert (share[angles > 55] == 0).all()
    assert (share[angles <= 30] > 0.99).all()
    between = share[(angles > 30) & (angles < 55)]
    assert (np.diff(between) < 1e-3).all()
    assert np.abs(np.diff(share)).max() < 0.03  # a ramp, no step


def test_the_sky_stays_bare() -> None:
    assert not covered(level(sky=np.ones((1, 400), bool)), SnowCoverParams(depth_cm=50)).any()


def test_normals_keep_to_the_side_of_the_camera() -> None:
    source, p = frame(), SnowCoverParams(depth_cm=200, max_slope=10)
    found = reference(source, scene(driving(source=source), 0, p), p)["normal"]
    toward = -np.einsum("...c,...c", source.camera.rays(), source["normal"])
    assert (np.einsum("...c,...c", source.camera.rays(), found)[toward > 0] < 0).all()


def test_material_turns_to_snow() -> None:
    source, p = level(), SnowCoverParams(depth_cm=60)
    found = reference(source, scene(info([looking()], camera=source.camera), 0, p), p)
    assert np.allclose(found["albedo"], p.snow_albedo, atol=1e-6)
    assert np.allclose(found["roughness"], p.snow_roughness, atol=1e-6)
    assert np.allclose(found["metallic"], 0, atol=1e-6)
    assert np.allclose(np.linalg.norm(found["normal"], axis=-1), 1)
    assert ((found["normal"] @ looking()[1, :3]) > 1 / np.hypot(1, p.max_slope) - 1e-9).all()


# ---- the field


@pytest.mark.parametrize("level_", range(3))
@pytest.mark.parametrize("border", [0.0, 0.5], ids=["border", "middle"])
def test_height_is_continuous_across_cells(level_: int, border: float) -> None:
    cell = BLOCK / snow.CELLS[level_]
    edge = (np.arange(-200, 200) + border) * cell
    other = np.linspace(-70, 70, len(edge))
    for x, z in ((edge, other), (other, edge)):
        low, high = (np.nextafter(x, side) if x is edge else x for side in (-np.inf, np.inf))
        left, right = (np.nextafter(z, side) if z is edge else z for side in (-np.inf, np.inf))
        assert np.abs(height(high, right) - height(low, left)).max() < 1e-12


@pytest.mark.parametrize("level_", range(3))
def test_the_cells_around_hold_every_ball(level_: int) -> None:
    """The sum over far more cells is the same."""
    rng = np.random.default_rng(level_)
    x, z = rng.uniform(-40, 40, (2, 500))
    cells, seed = snow.CELLS[level_], snow.SEEDS[level_]
    u, w = x * cells / BLOCK, z * cells / BLOCK
    column, row = np.floor(u).astype(np.int64), np.floor(w).astype(np.int64)
    total = np.zeros(500)
    for i in range(-5, 6):
        for j in range(-5, 6):
            dx, dz, weight = snow._ball(column + i, row + j, u - column - i - 0.5, w - row - j - 0.5, seed)
            total += weight * np.maximum(1 - (dx**2 + dz**2) / snow.RADIUS**2, 0) ** 3
    assert np.allclose(snow.metaballs(x, z, (0, 0))[0][level_], total, rtol=1e-9, atol=1e-12)


def test_slopes_are_those_of_the_height() -> None:
    rng = np.random.default_rng(0)
    x, z = rng.uniform(0, 160, (2, 300))
    _, along_x, along_z = snow.metaballs(x, z, (2, -7))
    step = 1e-5
    for axis, found in (((step, 0), along_x), ((0, step), along_z)):
        after, before = (snow.metaballs(x + s * axis[0], z + s * axis[1], (2, -7))[0] for s in (1, -1))
        assert np.allclose(found, (after - before) / (2 * step), atol=1e-5)


def test_blocks_join() -> None:
    """A place is the same from this block's corner and from the next one's, also in front of the origin."""
    rng = np.random.default_rng(0)
    x, z = rng.uniform(0, 160, (2, 300))
    for block in ((0, 0), (-3, 5), (25_000, -25_000)):
        assert np.allclose(height(x, z, block), height(x - BLOCK, z + BLOCK, (block[0] + 1, block[1] - 1)), atol=1e-9)


# ---- anchoring


def approaching(origin: tuple[float, float, float], shape: tuple[int, int] = (100, 100)) -> tuple[Any, list[GBuffer]]:
    """Two frames of a wall 30 m ahead, half road and all of it facing upwards: the same points in the same pixels.

    The second camera stands 12 m nearer and has so much shorter a focal length.
    """
    rows, columns = shape
    seen = Camera(width=columns, height=rows, K=np.array([[64, 0, columns / 2 - 0.3], [0, 64, rows / 2], [0, 0, 1]]))
    clip = info([looking(), looking((0.0, 1.6, -12.0))], camera=seen, origin=origin)
    K = clip.K.copy()
    K[1, :2, :2] *= 18 / 30
    clip = dataclasses.replace(clip, K=K)
    drawn = dict(frame(columns, rows)) | {
        "normal": np.broadcast_to(np.float32([0, -1, 0]), (*shape, 3)).copy(),
        "sky": np.zeros(shape, bool),
        "vehicle": np.zeros(shape, np.int32),
    }
    depths = (np.full(shape, depth, np.float32) for depth in (30, 18))
    return clip, [GBuffer(drawn | {"depth": d}, camera=clip.camera(i), time=0.0) for i, d in enumerate(depths)]


@pytest.mark.parametrize("origin", ORIGINS, ids=["here", "5e5", "4e6"])
def test_coverage_stays_on_its_surface(opencl_device: OpenCLBackend, origin: tuple[float, float, float]) -> None:
    p = SnowCoverParams(depth_cm=2)
    clip, frames = approaching(origin)
    far, near = (on(opencl_device, f, scene(clip, i, p), p)["snow_coverage"] for i, f in enumerate(frames))
    assert far.std() > 0.1
    assert np.abs(far - near).max() < 1e-4


def test_coverage_of_the_street_is_the_same_from_any_frame() -> None:
    p = SnowCoverParams(depth_cm=2)
    cameras = [street.camera(index, width=160, height=88) for index in range(13)]
    boxes = [street.boxes(index) for index in range(13)]
    clip = info([camera.camera_to_world for camera in cameras], boxes, camera=cameras[0])
    source = street.frame(0, width=160, height=88)
    still = ~source["sky"] & (source["vehicle"] == 0)
    places = source.camera.to_world(source.camera.unproject(source["depth"])[still])
    heights = []
    for index in (0, 6, 12):
        held = {name: _widened(value) for name, value in scene(clip, index, p).world.items()}
        heights.append(_height(cameras[index].to_camera(places), source["road"][still], held, p))
    for other in heights[1:]:
        here, there = (snow.coverage(h, cover_cm=1, gamma=0.9, convention="physical") for h in (heights[0], other))
        # Ruts of what has not come into view yet are not looked for where no pixel can show them.
        ahead = (cameras[12].to_camera(places)[:, 2] > 1) & _in_view(cameras[12], places)
        assert ahead.sum() > 2_000
        assert np.abs(here - there)[ahead].max() < 1e-6


def _in_view(camera: Camera, places: Array) -> NDArray[np.bool_]:
    u, v, _ = np.moveaxis(camera.project(camera.to_camera(places)), -1, 0)
    return np.asarray((u > -0.5) & (u < camera.width - 0.5) & (v > -0.5) & (v < camera.height - 0.5))


def _widened(value: Any) -> Any:
    return value.astype(np.float64) if getattr(value, "dtype", None) == np.float32 else value


def _height(point: Array, road: NDArray[np.bool_], held: dict[str, Any], p: SnowCoverParams) -> Array:
    names = ("vehicle_row", "vehicle_block", "vehicle_frame", "vehicle_kept", "track_segment", "track_path")
    given = p.arguments()
    names_p = ("depth_cm", "bumps", "road_share", "road_bare", "convention")
    own = {name: given[name] for name in (*names_p, *(n for n in given if n.startswith("track_")))}
    nobody, zero = np.zeros(len(point), np.int32), np.zeros(len(point))
    tables = {name: held[name] for name in names}
    return snow.lying(point, road=road, vehicle=nobody, footprint2=zero, **tables, **own)[0]


def test_deep_snow_lies_smooth() -> None:
    """Up to the relief the depth strays with its mean; deeper snow keeps the relief."""
    clip, _ = approaching(ORIGINS[0])
    for depth_cm, stray_cm in ((1, 0.3), (5, 1.5), (50, 1.5), (200, 1.5)):
        p = SnowCoverParams(depth_cm=depth_cm)
        held = {name: _widened(value) for name, value in scene(clip, 0, p).world.items()}
        x, z = np.meshgrid(np.arange(0, 40, 0.13), np.arange(0, 40, 0.13))
        point = np.stack([x, np.ones_like(x), z + 5], axis=-1).reshape(-1, 3)
        height = 100 * _height(point, np.zeros(len(point), bool), held, p)
        assert height.std() == pytest.approx(stray_cm, rel=0.1)
        assert height.mean() == pytest.approx(depth_cm, rel=0.02)


def test_a_vehicle_carries_its_snow(opencl_device: OpenCLBackend) -> None:
    """Camera and car move and turn together; the coverage of the car is the same, that of what has no box is not."""
    p = SnowCoverParams(depth_cm=1)
    there = looking((8.0, 1.6, -3.0), yaw=25)
    offset = np.array([0.5, -0.9, -10.0])
    places = [looking()[:3, 3] + offset, there[:3, 3] + looking(yaw=25)[:3, :3] @ (looking()[:3, :3].T @ offset)]
    rows, columns = 20, 40
    ids = np.repeat(np.int32([3, 9]), columns // 2)[None].repeat(rows, axis=0)
    source = frame(
        columns,
        rows,
        normal=np.broadcast_to(np.float32([0, -1, 0]), (rows, columns, 3)).copy(),
        depth=np.full((rows, columns), 10, np.float32),
        sky=np.zeros((rows, columns), bool),
        vehicle=ids,
    )
    clip = info([looking(), there], [[box(2, places[0])], [box(2, places[1], yaw=25)]], camera=source.camera)
    before, after = (on(opencl_device, source, scene(clip, i, p), p)["snow_coverage"] for i in range(2))
    assert np.abs(before - after)[ids == 3].max() < 1e-4
    assert np.abs(before - after)[ids == 9].mean() > 0.05


def test_a_vehicle_that_drives_sheds_snow() -> None:
    clip = driving()
    p = SnowCoverParams(vehicle_share=0.4)
    held = scene(clip, 3, p).world
    assert held["vehicle_kept"][held["vehicle_row"][1]] == np.float32(0.4)
    assert held["vehicle_kept"][held["vehicle_row"][3]] == 1
    assert held["vehicle_row"][2] == 0  # no box of that number: the world's


# ---- ruts


def on_road(x: Array, z: Array, held: dict[str, Any], p: SnowCoverParams, wobble: float = 0.0) -> Array:
    own = {name: value for name, value in vars(p).items() if name.startswith("track_")}
    tables = {name: _widened(held[name]) for name in ("track_segment", "track_path")}
    return snow.kept_in_tracks(x, z, np.full(np.shape(x), wobble), **tables, **own)


def test_ruts_lie_left_and_right_of_the_way() -> None:
    p = SnowCoverParams()
    clip = info([looking((3.0, 1.6, -1.0 * i)) for i in range(20)])
    held = dict(scene(clip, 0, p).world)
    x = 3.0 + np.array([-3.0, -0.8, 0.0, 0.8, 3.0])
    for z in (-1.0, -10.0, -150.0):  # on the way, and where it goes on
        share = on_road(x, np.full(5, z) - held["vehicle_block"][0, 1] * BLOCK, held, p)
        assert np.allclose(share, [1, 0.06, 0.6, 0.06, 1])


def test_ruts_wander_together() -> None:
    p = SnowCoverParams()
    held = dict(scene(info([looking((0.0, 1.6, -1.0 * i)) for i in range(20)]), 0, p).world)
    x = np.linspace(-3, 3, 121)
    z = np.full(x.shape, -10.0) - held["vehicle_block"][0, 1] * BLOCK
    here, aside = (on_road(x - held["vehicle_block"][0, 0] * BLOCK, z, held, p, wobble) for wobble in (0.0, 0.1))
    assert here.min() < 0.1
    assert np.allclose(aside[2:], here[:-2]) or np.allclose(aside[:-2], here[2:])


def test_a_walker_gives_no_vehicle_its_frame() -> None:
    """Vehicles without a box are numbered after those with one, whatever the numbers of the walkers."""
    car, walker = box(3, (3.0, 0.7, -9.0)), dataclasses.replace(box(4, (0.0, 0.9, -5.0)), category="Pedestrian")
    rows = scene(info([looking()], [[car, walker]]), 0, SnowCoverParams()).world["vehicle_row"]
    assert len(rows) == 5
    assert rows[4] == 1


def test_a_camera_that_stands_has_driven_straight() -> None:
    p = SnowCoverParams()
    held = dict(scene(info([looking(yaw=90)] * 3), 0, p).world)
    assert held["track_count"] == 1
    x, z = np.array([-20.0, -20.0]), np.array([0.8, 3.0])
    assert np.allclose(on_road(x - held["vehicle_block"][0, 0] * BLOCK, z, held, p), [0.06, 1])


def test_a_car_that_turns_back_has_ruts() -> None:
    places = [0, 1, 2, 3, 2, 1, 0]
    clip = info([looking((0.0, 1.6, 5.0 - i)) for i in range(7)], [[box(1, (3.0, 0.7, -9.0 - z))] for z in places])
    held = scene(clip, 0, SnowCoverParams()).world
    assert held["track_count"] == 2
    assert np.isfinite(held["track_segment"]).all()


def test_pieces_out_of_sight_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    source = frame(pose=looking((2.0, 1.6, 0.0), yaw=30, pitch=10, roll=5))
    clip = driving(40)
    clip = dataclasses.replace(
        clip, camera_to_world=np.concatenate([source.camera.camera_to_world[None], clip.camera_to_world[1:]])
    )
    p = SnowCoverParams()
    few = scene(clip, 0, p)
    monkeypatch.setattr("aw4d.world.tracks._view", lambda camera: [])
    everything = scene(clip, 0, p)
    assert few.world["track_segment"].shape < everything.world["track_segment"].shape
    a, b = (reference(source, held, p) for held in (few, everything))
    assert all(np.array_equal(a[name], b[name]) for name in RESULTS)


@pytest.mark.parametrize("pose", [looking(pitch=-90), looking(pitch=90), looking(roll=180)], ids=["down", "up", "over"])
def test_a_camera_that_looks_anywhere_has_its_ruts(pose: Array) -> None:
    held = scene(info([pose, *(looking((0.0, 1.6, -2.0 * i)) for i in range(1, 9))]), 0, SnowCoverParams()).world
    assert held["track_count"] == 1


# ---- the paper's form


def test_the_printed_blend_covers_half_where_there_is_no_snow() -> None:
    assert np.allclose(covered(level(), SnowCoverParams(depth_cm=0, convention="paper")), 0.53, atol=0.001)


def test_the_printed_kernel() -> None:
    rho = 0.5 / 1.5 ** np.arange(3)
    integral = 315 / (64 * np.pi * rho**9) * np.pi * rho**8 / 4  # of W over the plane
    density = (np.array(snow.CELLS) / BLOCK) ** 2
    expected = (0.7 ** np.arange(3) * integral * density).sum()
    rng = np.random.default_rng(0)
    sums, *_ = snow.metaballs(*rng.uniform(0, 160, (2, 40_000)), (0, 0))
    assert (snow._amplitudes(True) @ sums).mean() == pytest.approx(expected, rel=0.01)


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str) -> None:
    source = frame()
    check(opencl_backend, source, scene(driving(source=source), 0, SETTINGS[name]), SETTINGS[name])


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    source, p = frame(*size), SnowCoverParams(displacement=True)
    check(opencl_backend, source, scene(driving(source=source), 0, p), p)


@pytest.mark.parametrize("origin", ORIGINS, ids=["here", "5e5", "4e6"])
@pytest.mark.parametrize(
    "pose",
    [
        looking((-1e3, 2.0, 700.0), yaw=130),
        looking(pitch=-90),
        looking(roll=180),
        looking((79.9999, 1.0, -0.0001), yaw=45, pitch=-35, roll=20),
    ],
    ids=["negative", "down", "upside down", "rolled"],
)
def test_every_place(opencl_device: OpenCLBackend, pose: Array, origin: tuple[float, float, float]) -> None:
    source, p = frame(pose=pose), SnowCoverParams()
    check(opencl_device, source, scene(driving(source=source, origin=origin), 0, p), p)


def test_street(opencl_device: OpenCLBackend) -> None:
    cameras = [street.camera(index, width=320, height=176) for index in range(9)]
    boxes = [street.boxes(index) for index in range(9)]
    clip = info([camera.camera_to_world for camera in cameras], boxes, camera=cameras[0])
    p = SnowCoverParams()
    check(opencl_device, street.frame(4, width=320, height=176), scene(clip, 4, p), p)


@pytest.mark.parametrize("planes", ["all sky", "no vehicles, far", "grazing", "metal"])
def test_hard_frames(opencl_device: OpenCLBackend, planes: str) -> None:
    shape = (54, 96)
    drawn: dict[str, Any] = {
        "all sky": {"sky": np.ones(shape, bool)},
        "no vehicles, far": {"vehicle": np.zeros(shape, np.int32), "depth": np.full(shape, 1e5, np.float32)},
        "grazing": {"normal": np.broadcast_to(np.float32([0, -1, 0]), (*shape, 3)).copy()},
        "metal": {"metallic": np.ones(shape, np.float32), "albedo": np.zeros((*shape, 3), np.float32)},
    }[planes]
    source, p = frame(**drawn), SnowCoverParams(displacement=True)
    check(opencl_device, source, scene(driving(source=source), 0, p), p)


def test_nothing_else_changes_a_bit(opencl_backend: OpenCLBackend) -> None:
    source, p = frame(97, 55), SnowCoverParams()
    found = on(opencl_backend, source, scene(driving(source=source), 0, p), p)
    bare = found["snow_coverage"] == 0
    assert 0.2 < bare.mean() < 0.9
    for name in ("albedo", "normal", "roughness", "metallic"):
        assert np.array_equal(found[name][bare], source[name][bare]), name
    assert np.array_equal(found["depth"], source["depth"])


def test_no_snow_hides_nothing_to_the_last_bit(opencl_backend: OpenCLBackend) -> None:
    source, p = frame(37, 13), SnowCoverParams(depth_cm=0.0)
    found = on(opencl_backend, source, scene(driving(source=source), 0, p), p)
    assert (found["snow_coverage"] == 0).all()
    assert (found["snow_bare"] == 1).all()


def test_what_deep_snow_of_nothing_leaves_keeps_its_digits(opencl_backend: OpenCLBackend) -> None:
    """Snow without colour or roughness: all that is left of a surface is what the snow leaves bare of it."""
    source, p = frame(37, 13), SnowCoverParams(snow_roughness=0.0, snow_albedo=(0.0, 0.0, 0.0))
    held = scene(driving(source=source), 0, p)
    truth, found = reference(source, held, p), on(opencl_backend, source, held, p)
    for name in ("albedo", "roughness"):
        assert error(found[name], truth[name])[0] <= BAR_P9999, name


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"depth_cm": -1.0}, "depth_cm"),
        ({"depth_cm": float("nan")}, "depth_cm"),
        ({"cover_cm": 0.0}, "cover_cm"),
        ({"flat_deg": 50.0, "steep_deg": 50.5}, "steep_deg"),
        ({"snow_albedo": (1.0, 1.0, 1.2)}, "snow_albedo"),
        ({"vehicle_share": 1.5}, "vehicle_share"),
        ({"convention": "literal"}, "convention"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        SnowCoverParams(**wrong)
