"""The built-in street: its planes are exact, agree with one another, and do not depend on how they were asked for."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import street
from aw4d.errors import InputError
from aw4d.gbuffer import PLANES, GBuffer
from aw4d.street import layout
from aw4d.street.parts import Material
from aw4d.street.render import Shot, follow, full_shot, in_shadow, unsorted
from aw4d.street.shapes import GLASS, House, Leaves, Openings, Rays, box, box_planes, ellipsoid, rod
from aw4d.street.sky import SUN
from aw4d.street.trace import Grid

WIDTH, HEIGHT = 320, 176
SAMPLED = (0, 28, 50)


@lru_cache(maxsize=8)
def small(index: int) -> GBuffer:
    """A frame at the tests' size."""
    return street.frame(index, width=WIDTH, height=HEIGHT)


def world_points(frame: GBuffer) -> NDArray[np.float64]:
    """World position of every pixel's surface, (H, W, 3)."""
    return frame.camera.to_world(frame.camera.unproject(frame["depth"]))


def world_normals(frame: GBuffer) -> NDArray[np.float64]:
    """World normal of every pixel's surface, (H, W, 3)."""
    return np.asarray(frame["normal"].astype(np.float64) @ frame.camera.camera_to_world[:3, :3].T)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (7, 13), (13, 7), (33, 1), (1, 33)])
def test_every_plane_is_valid_at_odd_sizes(width: int, height: int) -> None:
    frame = street.frame(3, width=width, height=height)
    assert set(frame) == set(PLANES)
    assert frame["depth"].shape == street.shadow(3, width=width, height=height).shape == (height, width)


@pytest.mark.parametrize("index", SAMPLED)
def test_normals_are_unit_and_face_the_camera(index: int) -> None:
    frame = small(index)
    normal = frame["normal"].astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-6)
    rays = frame.camera.rays()
    assert (np.einsum("hwc,hwc->hw", normal, rays) <= 1e-6 * np.linalg.norm(rays, axis=-1)).all()


def test_normals_are_those_of_the_depth_where_it_is_planar() -> None:
    """On a plane 1/z is affine in the pixel, and its gradient is the normal."""
    frame = small(28)
    K = frame.camera.K
    w = 1 / frame["depth"].astype(np.float64)
    du, dv = (w[1:-1, 2:] - w[1:-1, :-2]) / 2, (w[2:, 1:-1] - w[:-2, 1:-1]) / 2
    centre = w[1:-1, 1:-1]
    bend = np.abs(w[1:-1, 2:] + w[1:-1, :-2] - 2 * centre) + np.abs(w[2:, 1:-1] + w[:-2, 1:-1] - 2 * centre)
    x, y, _ = np.moveaxis(frame.camera.rays()[1:-1, 1:-1], -1, 0)
    n = -np.stack([K[0, 0] * du, K[1, 1] * dv, centre - K[0, 0] * x * du - K[1, 1] * y * dv], axis=-1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    cosine = np.einsum("hwc,hwc->hw", n, frame["normal"][1:-1, 1:-1])
    planar = (bend < 1e-6 * centre) & ~frame["sky"][1:-1, 1:-1]
    assert planar.mean() > 0.3
    assert (cosine[planar] > np.cos(np.radians(1))).mean() > 0.99


@pytest.mark.parametrize("index", SAMPLED)
def test_sky_holds_nothing_else(index: int) -> None:
    frame = small(index)
    sky = frame["sky"]
    assert 0.05 < sky.mean() < 0.6
    assert not (frame["road"] & sky).any()
    assert not (frame["vehicle"] > 0)[sky | frame["road"]].any()
    assert not (frame["street_light"] > 0)[sky | frame["road"] | (frame["vehicle"] > 0)].any()
    assert (frame["depth"][sky] == np.float32(street.SKY_DEPTH_M)).all()
    assert (frame["normal"][sky] == (0, 0, -1)).all()
    assert not frame["albedo"][sky].any()
    assert (frame["roughness"][sky] == 1).all()


def test_sky_depth_is_the_99th_percentile_of_the_clip() -> None:
    depth = [small(index)["depth"][~small(index)["sky"]] for index in SAMPLED]
    assert np.percentile(np.concatenate(depth), 99) == pytest.approx(street.SKY_DEPTH_M, rel=0.05)


@pytest.mark.parametrize("index", SAMPLED)
def test_road_lies_on_the_ground_and_the_kerb_stands_on_it(index: int) -> None:
    frame = small(index)
    points, normals = world_points(frame), world_normals(frame)
    road = frame["road"]
    assert np.abs(points[road][:, 1]).max() < 1e-3
    np.testing.assert_allclose(normals[road], np.broadcast_to((0, 1, 0), normals[road].shape), atol=1e-6)

    across, up = np.abs(points[..., 2]), points[..., 1]
    bare = ~road & ~frame["sky"] & (frame["vehicle"] == 0) & (frame["street_light"] == 0)
    top = bare & (across > layout.ROAD_HALF + 0.02) & (across < layout.ROAD_HALF + 0.15) & (normals[..., 1] > 0.999)
    top &= up < 0.3
    assert top.any()
    assert np.abs(up[top] - layout.KERB).max() < 1e-3
    face = bare & (np.abs(across - layout.ROAD_HALF) < 1e-3) & (up > 0.01) & (up < layout.KERB - 0.01)
    assert face.any()
    np.testing.assert_allclose(normals[face][:, 2], -np.sign(points[face][:, 2]), atol=1e-6)


def test_a_point_seen_in_one_frame_is_where_another_frame_sees_it() -> None:
    """A ray from the second camera through a static point meets it, or something before it, but nothing behind it."""
    first = small(10)
    camera = street.camera(18, width=WIDTH, height=HEIGHT)
    still = ~first["sky"] & (first["vehicle"] == 0)
    # A leaf's outline is hashed from its position, which is known here in single precision alone.
    shot = full_shot(10, first.camera)
    seen = follow(shot)
    leaves = np.zeros(seen.order.size, np.bool_)
    for number, run in seen.runs:
        leaves[run] = shot.parts[number].material is Material.LEAVES
    still &= ~unsorted(seen, leaves).reshape(HEIGHT, WIDTH)
    pixels = camera.project(camera.to_camera(world_points(first)[still]))
    inside = (pixels[:, 2] > 1) & (np.abs(pixels[:, 0] - WIDTH / 2) < WIDTH / 2 - 1)
    inside &= np.abs(pixels[:, 1] - HEIGHT / 2) < HEIGHT / 2 - 1
    pixels = pixels[inside]
    pixels = pixels[np.lexsort((pixels[:, 0], np.round(pixels[:, 0]), np.round(pixels[:, 1])))]

    K = camera.K
    direction = np.stack([(pixels[:, 0] - K[0, 2]) / K[0, 0], (pixels[:, 1] - K[1, 2]) / K[1, 1], np.ones(len(pixels))])
    number = np.round(pixels[:, 1]).astype(int) * WIDTH + np.round(pixels[:, 0]).astype(int)
    starts = np.searchsorted(number, np.arange(WIDTH * HEIGHT + 1))
    again = Shot(camera, layout.parts(18), layout.cars(18), direction, Grid(HEIGHT, WIDTH, starts), 1.0)
    hits = follow(again)
    depth = unsorted(hits, hits.depth)
    beyond = depth / pixels[:, 2] - 1
    assert (beyond < 1e-3).mean() > 0.995  # the rest slips past an edge, by the depth's single precision
    assert (np.abs(beyond) < 1e-3).mean() > 0.7


def test_textures_stay_on_their_surfaces() -> None:
    """The albedo of house fronts and road is the same in two frames, up to the change of the pixel's footprint."""
    first, second = small(10), small(12)
    near = ~first["sky"] & (first["vehicle"] == 0) & (first["depth"] < 20)
    pixels = second.camera.project(second.camera.to_camera(world_points(first)[near]))
    u, v = (np.round(pixels[:, axis]) for axis in (0, 1))
    inside = (u >= 0) & (u < WIDTH) & (v >= 0) & (v < HEIGHT)
    u, v, z = u[inside].astype(int), v[inside].astype(int), pixels[inside, 2]
    same = np.abs(second["depth"][v, u] / z - 1) < 5e-3
    difference = np.abs(second["albedo"][v, u] - first["albedo"][near][inside]).mean(axis=-1)[same]
    shuffled = np.abs(second["albedo"][v, u][same] - np.roll(first["albedo"][near][inside][same], 997, axis=0))
    assert same.mean() > 0.5
    assert difference.mean() < 0.25 * shuffled.mean()


def brute_force(shot: Shot, rays: Rays) -> NDArray[np.float64]:
    """Nearest t of rays against every part, without grids or bounds."""
    return np.min([part.shape.hit(rays)[0] for part in shot.parts], axis=0)


@pytest.mark.parametrize(("width", "height"), [(WIDTH, HEIGHT), (7, 13), (1, 1)])
def test_grids_and_bounds_lose_no_part(width: int, height: int) -> None:
    shot = full_shot(50, street.camera(50, width=width, height=height))
    hits = follow(shot)
    chosen = np.random.default_rng(5).choice(hits.order.size, min(400, hits.order.size), replace=False)
    x, y, z = shot.camera.camera_to_world[:3, 3]
    d = hits.ray[:, chosen]
    expected = brute_force(shot, Rays((float(x), float(y), float(z)), (d[0], d[1], d[2])))
    np.testing.assert_array_equal(hits.depth[chosen], expected)


def test_shadows_are_those_of_every_part() -> None:
    shot = full_shot(50, street.camera(50, width=WIDTH, height=HEIGHT))
    hits = follow(shot)
    hidden = in_shadow(shot, hits)
    lit_side = np.flatnonzero((hits.normal.T @ SUN > 0) & (np.arange(hits.order.size) >= hits.first))
    chosen = np.random.default_rng(6).choice(lit_side, 400, replace=False)
    start = hits.point[:, chosen] + 1e-3 * SUN[:, None]
    rays = Rays((start[0], start[1], start[2]), (float(SUN[0]), float(SUN[1]), float(SUN[2])))
    expected = np.any([part.shape.blocks(rays) for part in shot.parts], axis=0)
    assert 0.1 < expected.mean() < 0.9
    np.testing.assert_array_equal(hidden[chosen], expected)


def test_shadow_is_dark_in_the_picture() -> None:
    frame = small(28)
    shadow = street.shadow(28, width=WIDTH, height=HEIGHT)
    assert not shadow[frame["sky"]].any()
    road = frame["road"] & (frame["depth"] < 40)
    luminance = frame["rgb"].mean(axis=-1)
    assert np.median(luminance[road & ~shadow]) > 2 * np.median(luminance[road & shadow])
    away = world_normals(frame) @ street.sun_direction < -1e-3
    assert shadow[away & ~frame["sky"]].all()


@pytest.mark.parametrize("index", SAMPLED)
def test_boxes_hold_their_cars(index: int) -> None:
    frame = small(index)
    points = world_points(frame)
    boxes = {box.track_id + 1: box for box in street.boxes(index)}
    assert len(boxes) == len(street.boxes(index))
    ids = np.unique(frame["vehicle"])[1:]
    assert len(ids) > 5
    for track in ids:
        assert boxes[track].contains(points[frame["vehicle"] == track]).mean() >= 0.99


def test_moving_cars_move_and_parked_cars_do_not() -> None:
    def places(index: int) -> dict[int, NDArray[np.float64]]:
        return {box.track_id + 1: box.object_to_world for box in street.boxes(index)}

    before, after = places(0), places(20)
    assert 15 < after[1][0, 3] - before[1][0, 3] < 25
    assert after[2][0, 3] - before[2][0, 3] == pytest.approx(-20)
    assert before[2][0, 0] == -1  # it looks where it drives
    parked = [track for track in before if track >= layout.FIRST_PARKED and track in after]
    assert len(parked) > 20
    assert all((before[track] == after[track]).all() for track in parked)


def test_lamp_heads_are_the_tops_of_the_lamps() -> None:
    lamps = street.lamps()
    checked = 0
    for index in SAMPLED:
        frame = small(index)
        points = world_points(frame)
        for lamp in np.unique(frame["street_light"])[1:]:
            own = points[frame["street_light"] == lamp]
            if len(own) < 40 or frame.camera.project(frame.camera.to_camera(lamps[lamp - 1]))[1] < 2:
                continue
            top = own[own[:, 1] >= own[:, 1].max() - 0.05]
            assert np.linalg.norm(top.mean(axis=0) - lamps[lamp - 1]) < 0.5
            checked += 1
    assert checked >= 4


def test_lamps_stand_clear_of_the_crossings() -> None:
    lamps = street.lamps()
    from_crossing = np.abs((lamps[:, 0] - layout.CROSSING + layout.BLOCK / 2) % layout.BLOCK - layout.BLOCK / 2)
    assert from_crossing.min() > layout.CROSSING_HALF + 1
    same_side = lamps[lamps[:, 2] > 0]
    np.testing.assert_allclose(np.diff(same_side[:, 0]), layout.LAMP_STEP)


def digest(frame: GBuffer) -> str:
    """Hash of all planes."""
    return hashlib.sha256(b"".join(frame[name].tobytes() for name in sorted(frame))).hexdigest()


def test_a_frame_is_the_same_alone_in_a_run_and_in_another_process() -> None:
    again = digest(street.frame(28, width=64, height=36))
    street.frame(3, width=64, height=36)
    assert digest(street.frame(28, width=64, height=36)) == again
    code = (
        "import hashlib; from aw4d import street; f = street.frame(28, width=64, height=36);"
        "print(hashlib.sha256(b''.join(f[n].tobytes() for n in sorted(f))).hexdigest())"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == again


def test_the_street_is_a_loop() -> None:
    turn = round(layout.LOOP / layout.SPEED * street.RATE)
    here, there = (street.frame(index, width=64, height=36) for index in (5, 5 + 3 * turn))
    np.testing.assert_allclose(there["depth"], here["depth"], rtol=1e-6)
    np.testing.assert_array_equal(there.camera.camera_to_world, here.camera.camera_to_world)
    assert there.time == pytest.approx(here.time + 72)


@pytest.mark.parametrize("call", [street.frame, street.camera, street.shadow])
def test_what_is_no_frame_is_refused(call: object) -> None:
    assert callable(call)
    with pytest.raises(InputError, match="frame number"):
        call(-1)
    with pytest.raises(InputError, match="at least 1x1"):
        call(0, width=0, height=3)


SOLIDS = [
    box((-1, -2, -3), (2, 1, 1)),
    rod((0, 0, 0), (1, 2, -1), 0.7),
    ellipsoid((0.2, -0.3, 0.1), (1.5, 0.7, 1.1)),
]


@pytest.mark.parametrize("solid", SOLIDS, ids=["box", "rod", "ellipsoid"])
def test_rays_meet_solids_where_they_enter_them(solid: object) -> None:
    """Just before the hit lies outside and just behind it inside; what misses has no inner point."""

    def inside(points: NDArray[np.float64]) -> NDArray[np.bool_]:
        within = np.ones(points.shape[:-1], np.bool_)
        for n, offset in solid.planes:  # type: ignore[attr-defined]
            within &= points @ n < offset
        for quadric in solid.quadrics:  # type: ignore[attr-defined]
            within &= np.square((points - quadric.centre) @ np.array(quadric.rows).T).sum(axis=-1) < 1
        return within

    random = np.random.default_rng(2)
    eye = np.array([6.0, 5.0, -4.0])
    d = random.uniform(-3, 3, (3, 500)) - eye[:, None]
    t, face = solid.hit(Rays((6.0, 5.0, -4.0), (d[0], d[1], d[2])))  # type: ignore[attr-defined]
    met = np.isfinite(t)
    assert 0.05 < met.mean() < 0.95
    along = eye + np.linspace(0, 2, 400)[:, None, None] * d.T
    assert not inside(along[:, ~met]).any()
    at = (eye[:, None] + t * d)[:, met]
    back = solid.normal((at[0], at[1], at[2]), face[met])  # type: ignore[attr-defined]
    assert (np.einsum("cn,cn->n", back, d[:, met]) < 0).all()
    assert inside((at - 1e-6 * back).T).mean() > 0.99
    assert not inside((at + 1e-6 * back).T).any()

    # The same rays, turned round: from many origins along one direction.
    origin = random.uniform(-4, 4, (3, 500))
    sun = (0.3, 0.8, -0.5)
    shaded = solid.blocks(Rays((origin[0], origin[1], origin[2]), sun))  # type: ignore[attr-defined]
    marched = inside(origin.T + np.linspace(0, 20, 4000)[:, None, None] * np.array(sun)).any(axis=0)
    assert (shaded | ~marched).all()
    assert (shaded == marched).mean() > 0.98


def test_only_the_green_lenses_shine() -> None:
    emissive = small(50)["emissive"]
    lit = emissive.max(axis=-1) > 0
    assert 0 < lit.sum() < 50
    assert (emissive[lit].argmax(axis=-1) == 1).all()


def test_windows_are_recessed() -> None:
    grid = Openings(
        start=0, base=0, pitch=2, storey=3, bays=2, floors=1, width=1, height=1.5, sill=1, door=-1, recess=0.2
    )
    low, high = (0.0, 0.0, 5.0), (4.0, 3.0, 9.0)
    planes = box_planes(low, high)
    house = House((low, high), (planes[4], *planes), openings=grid)
    x = np.array([1.0, 2.0, 1.0, 3.0])
    y = np.array([1.7, 1.7, 0.5, 2.4])
    t, face = house.hit(Rays((x, y, np.zeros(4)), (0.0, 0.0, 1.0)))
    np.testing.assert_allclose(t, [5.2, 5.0, 5.0, 5.2])
    np.testing.assert_array_equal(face, [GLASS, 0, 0, GLASS])
    # High sun: the top of the pane lies in the shade of the lintel, the bottom does not.
    pane_y = np.array([2.45, 1.05])
    shaded = house.blocks(Rays((np.ones(2), pane_y, np.full(2, 5.199)), (0.0, 0.8, -0.6)))
    np.testing.assert_array_equal(shaded, [True, False])
    # Into the house there is no way.
    assert house.blocks(Rays((np.ones(1), np.ones(1) * 1.5, np.full(1, 5.199)), (0.0, 0.6, 0.8))).all()


def test_leaves_lie_on_their_layers() -> None:
    clump = Leaves((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.08, 5)
    random = np.random.default_rng(4)
    d = np.concatenate([random.uniform(-0.3, 0.3, (2, 2000)), np.ones((1, 2000))])
    t, _ = clump.hit(Rays((0.0, 0.0, -4.0), (d[0], d[1], d[2])))
    radius = np.linalg.norm(np.array([[0.0], [0.0], [-4.0]]) + t * d, axis=0)[np.isfinite(t)]
    assert np.minimum(np.abs(radius - 1), np.abs(radius - 0.84)).max() < 1e-9
    assert 0.1 < np.isfinite(t).mean() < 0.95
