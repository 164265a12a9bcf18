"""Puddles: their share of the road, level water, anchored to the world; and every kernel against the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d import street
from aw4d.backend_numpy import NumpyBackend
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.params import PuddlesParams
from aw4d.world import anchor
from reference_numpy.fbm import fbm
from reference_numpy.puddles import printed_mask
from reference_numpy.ramps import smoothstep
from tests.ground_inputs import FAR, SIZES, check, frame, pose, reference, run, scene, unchanged, wall
from tests.lit_inputs import unchecked

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

SETTINGS = {
    "default": PuddlesParams(),
    "fine": PuddlesParams(share=0.5, size_m=5, octaves=5, shore_m=0.05, optical_depth=3),
    "one octave": PuddlesParams(octaves=1, shore_m=2),
    "all": PuddlesParams(share=1),
    "paper": PuddlesParams(convention="paper"),
}
SIZE = (54, 96)
ORIGIN = np.zeros(3, dtype=np.int64)


def mask_at(x: np.ndarray, z: np.ndarray, p: PuddlesParams, block: np.ndarray = ORIGIN) -> np.ndarray:
    """The mask at places of a level road."""
    a = p.arguments()
    weight = a["weight"].astype(np.float64)
    noise = fbm(x, z, block=block, cells=a["cells"], weight=weight, seed=a["seed"])
    if p.convention == "paper":
        return printed_mask(noise)
    return smoothstep(0.0, 1.0, (noise - a["level"]) * a["steepness"] + 0.5)


def plane(side_m: float, count: int = 700) -> tuple[np.ndarray, np.ndarray]:
    x, z = np.meshgrid(*[np.linspace(0, side_m, count) + 0.123] * 2)
    return x, z


@pytest.mark.parametrize("share", [0.0, 0.02, 0.2, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("shape", [{}, {"size_m": 20, "octaves": 3, "persistence": 0.5}, {"shore_m": 2.0}])
def test_the_share_of_the_road_is_met(share: float, shape: dict[str, Any]) -> None:
    mask = mask_at(*plane(3_000.0), PuddlesParams(share=share, **shape))
    assert mask.mean() == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("shore_m", [0.1, 0.5])
def test_shores_are_as_wide_as_asked(shore_m: float) -> None:
    """The slope of the mask at its middle is that of a shore: 3/2 of its height over its width, on average."""
    x, z = plane(100.0, 1500)
    p = PuddlesParams(shore_m=shore_m)
    step = 1e-4
    mask = mask_at(x, z, p)
    slope = np.hypot(mask_at(x + step, z, p) - mask, mask_at(x, z + step, p) - mask) / step
    middle = np.abs(mask - 0.5) < 0.2
    assert np.sqrt((slope[middle] ** 2).mean()) * shore_m == pytest.approx(1.4, rel=0.2)


def test_only_level_road_is_under_water() -> None:
    source = frame()
    up = source.camera.camera_to_world[1, :3]
    found = reference("puddles", source, PuddlesParams(share=1))["puddle"]
    slope = np.degrees(np.arccos(np.clip(source["normal"] @ up, -1, 1)))
    here = source["road"] & ~source["sky"]
    assert not found[~here].any()
    assert (found[here & (slope < 7.9)] == 1).all()
    assert not found[slope > 16.1].any()
    assert ((found >= 0) & (found <= 1)).all()
    hung = frame(normal=np.broadcast_to(-up.astype(np.float32), (*SIZE, 3)).copy())
    assert not reference("puddles", hung, PuddlesParams(share=1))["puddle"].any()


def test_water_is_level_smooth_and_dark() -> None:
    source = frame()
    up = source.camera.camera_to_world[1, :3]
    found = reference("puddles", source, PuddlesParams(share=1))
    full = found["puddle"] == 1
    assert full.any()
    assert np.allclose(found["normal"][full], up, atol=1e-6)
    assert np.allclose(np.linalg.norm(found["normal"], axis=-1), 1, atol=1e-6)
    assert (found["roughness"][full] == 0).all()
    assert (found["albedo"][full] < 0.5 * source["albedo"][full]).all()  # exp(-0.7), and the slanting way is longer
    assert (found["albedo"] <= source["albedo"]).all()


def test_without_water_nothing_changes(opencl_device: OpenCLBackend) -> None:
    source = frame()
    for backend in (NumpyBackend(), opencl_device):
        found = run(backend, "puddles", source, PuddlesParams(share=0))
        assert not found["puddle"].any()
        assert unchanged(found, source, ["albedo", "normal", "roughness"])


def test_no_puddle_lies_on_snow() -> None:
    source, p = frame(), PuddlesParams(share=0.5)
    covered = np.random.default_rng(1).random(SIZE, dtype=np.float32)
    bare = reference("puddles", source, p)["puddle"]
    assert np.allclose(reference("puddles", source, p, snow_bare=1 - covered)["puddle"], bare * (1.0 - covered))


def test_the_printed_mask() -> None:
    """Three octaves of 1/2, 1/4, 1/8; 20 m to the first one's cell; it changes neither normal nor albedo."""
    p = PuddlesParams(convention="paper")
    a = p.arguments()
    assert a["cells"] == 8
    assert np.array_equal(a["weight"], [0.5, 0.25, 0.125])
    noise = np.array([0.0, 0.28, 0.35, 0.7, 0.875])
    once = np.array([0.0, 0.352, 0.5, 1.0, 1.0])
    t = np.maximum((once - 0.2) / 0.8, 0)
    assert np.allclose(printed_mask(noise), t * t * (3 - 2 * t))
    source = frame()
    assert unchanged(reference("puddles", source, p), source, ["albedo", "normal"])


def test_the_printed_mask_floods_the_road() -> None:
    mask = mask_at(*plane(3_000.0), PuddlesParams(convention="paper"))
    assert 0.5 < mask.mean() < 0.7
    assert (mask > 0.5).mean() > 0.5


# ---- anchored to the world


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("origin", [(0, 0, 0), FAR])
def test_a_point_is_as_wet_from_wherever_it_is_seen(
    opencl_device: OpenCLBackend, name: str, origin: tuple[float, float, float]
) -> None:
    """10,000 points from 4.5 m and from 1.5 m."""
    seen = []
    for ahead in (0.0, 3.0):
        source = wall(4.5, focal=25.0, ahead=ahead)
        seen.append(run(opencl_device, "puddles", source, SETTINGS[name], scene(source, origin=origin))["puddle"])
    assert np.abs(seen[0] - seen[1]).max() < 1e-4
    assert name == "all" or np.ptp(seen[0]) > 0.2


def test_the_street_keeps_its_puddles() -> None:
    """Points that one frame sees, with the arguments of another: of frames 3 m and 100 m on, and of another block."""
    p, (here, *others) = PuddlesParams(), (street.camera(i, width=320, height=176) for i in (20, 23, 120, 190))
    depth = street.frame(20, width=320, height=176)["depth"].astype(np.float64)
    world = (here.rays() * depth[..., None]) @ here.camera_to_world[:3, :3].T + here.camera_to_world[:3, 3]
    masks = []
    for eye in (here, *others):
        given = anchor(eye, 0.0)
        R, at = eye.camera_to_world[:3, :3], eye.camera_to_world[:3, 3]
        point = (world - at) @ R  # in that camera's frame
        turned = (given["to_world"].astype(np.float64) + given["to_world_lo"]).reshape(3, 3)
        place = point @ turned.T + (given["eye"].astype(np.float64) + given["eye_lo"])
        masks.append(mask_at(place[..., 0], place[..., 2], p, given["block"]))
    assert np.ptp(masks[0]) > 0.9
    for mask in masks[1:]:
        assert np.abs(mask - masks[0]).max() < 1e-8


def test_a_crop_has_the_same_puddles(opencl_device: OpenCLBackend) -> None:
    source = frame()
    left, top = 13, 20
    eye = source.camera
    K = eye.K.copy()
    K[:2, 2] -= left, top
    small = type(eye)(width=eye.width - left, height=eye.height - top, K=K, camera_to_world=eye.camera_to_world)
    cut = GBuffer({name: source[name][top:, left:].copy() for name in source}, camera=small, time=0.0)
    whole = run(opencl_device, "puddles", source, PuddlesParams())["puddle"]
    part = run(opencl_device, "puddles", cut, PuddlesParams())["puddle"]
    assert np.abs(whole[top:, left:] - part).max() < 1e-4
    assert part.max() > 0.9


def test_time_does_not_move_puddles(opencl_device: OpenCLBackend) -> None:
    source = frame()
    first, *later = (run(opencl_device, "puddles", source, PuddlesParams(), scene(source, t)) for t in (0, 0.1, 1e6))
    for found in later:
        assert all(np.array_equal(found[key], first[key]) for key in found)


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("origin", [(0, 0, 0), FAR])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str, origin: tuple[float, float, float]) -> None:
    source = frame()
    check(opencl_backend, "puddles", source, SETTINGS[name], scene(source, origin=origin))


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check(opencl_backend, "puddles", frame(*size), PuddlesParams(share=0.5))


@pytest.mark.parametrize("name", SETTINGS)
def test_street(opencl_device: OpenCLBackend, name: str) -> None:
    source = street.frame(28, width=320, height=176)
    snow = np.random.default_rng(2).random((176, 320), dtype=np.float32)
    check(opencl_device, "puddles", source, SETTINGS[name])
    check(opencl_device, "puddles", source, SETTINGS[name], snow_bare=snow)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, 2.0, -3.0])
@pytest.mark.parametrize("place", [(-79.99, 80.0), (0.0, -1e-4), (-160.0, 160.0), (-1e5, 3e5)])
def test_places(opencl_device: OpenCLBackend, yaw: float, place: tuple[float, float]) -> None:
    """Corners of blocks, negative coordinates, a camera that rolls over."""
    at = pose(*place, yaw=yaw)
    check(opencl_device, "puddles", frame(at=at), PuddlesParams(share=0.5))
    at[:3, :2] *= -1  # upside down
    check(opencl_device, "puddles", frame(at=at), PuddlesParams(share=0.5))


@pytest.mark.parametrize(
    ("plane_", "value"),
    [
        ("normal", 0.0),
        ("normal", 1.0),
        ("roughness", 0.0),
        ("albedo", 1.2),
        ("albedo", -0.01),
        ("depth", 1e-3),
        ("depth", 1e4),
    ],
)
def test_hard_surfaces(opencl_device: OpenCLBackend, plane_: str, value: float) -> None:
    source = frame()
    hard = unchecked(source, **{plane_: np.full_like(source[plane_], value)})
    for p in (PuddlesParams(share=0.5), SETTINGS["paper"]):
        # Between the road's normal and the water's a component may pass through 0: each keeps its own last digit.
        up = np.abs(source.camera.camera_to_world[1, :3])
        last_digit = {"normal": 2.0**-24 * np.maximum(np.abs(hard["normal"]), up).astype(np.float64)}
        check(opencl_device, "puddles", hard, p, inherent=last_digit)


@pytest.mark.parametrize("sky", [True, False])
def test_all_sky_and_none(opencl_device: OpenCLBackend, sky: bool) -> None:
    check(opencl_device, "puddles", frame(sky=np.full(SIZE, sky), road=np.ones(SIZE, dtype=bool)), PuddlesParams())


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"share": 1.1}, "share"),
        ({"size_m": 7.0}, "size_m"),
        ({"size_m": 0.1, "octaves": 8}, "size_m"),
        ({"shore_m": 0.0}, "shore_m"),
        ({"convention": "literal"}, "convention"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        PuddlesParams(**wrong)
