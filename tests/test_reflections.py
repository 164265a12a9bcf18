"""Reflections: a mirror's exact picture, what must not change, energy, and every kernel against the reference."""

from __future__ import annotations

import inspect
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import street
from aw4d.backend import frame_arguments
from aw4d.camera import Camera
from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.environment import Environment, arrays, environment
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import in_camera
from aw4d.params import AmbientParams, ReflectionsParams
from aw4d.scene import Scene
from aw4d.world import anchor
from reference_numpy.ambient import ambient
from reference_numpy.environment import FADING, specular_occlusion
from reference_numpy.mirrored import Mirrored
from reference_numpy.reflections import reflections
from reference_numpy.row_means import BLOCKS, RowMeans
from tests import lit_inputs

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

Planes = dict[str, NDArray[Any]]
SIZES = [(1, 1), (1, 9), (9, 1), (13, 7), (16, 3), (17, 3), (33, 2), (129, 5)]
EYE_HEIGHT, WALL = 1.5, 20.0  # [m]
WHITE = 5_000.0  # [cd/m2]
LEVEL = np.array([[1.0, 0, 0, 0], [0, -1, 0, EYE_HEIGHT], [0, 0, -1, 0], [0, 0, 0, 1]])


@cache
def white() -> Environment:
    """Radiance 1 from everywhere, no sun, where white is 1 cd/m2."""
    ones = np.ones((64, 128, 3))
    return Environment(
        radiance=ones, backdrop=ones, sun_direction=np.array([0.0, 1.0, 0.0]), sun_irradiance=np.zeros(3)
    )


def scene(source: GBuffer, around: Environment, white_cd_m2: float = 1.0) -> Scene:
    tables = arrays(around, source.camera, white_cd_m2).arguments()
    return Scene(lights=in_camera([], source.camera), environment=tables, world=anchor(source.camera, 0.0))


def arguments(
    source: GBuffer, around: Environment, p: ReflectionsParams, working: Planes, white_cd_m2: float = 1.0
) -> dict[str, Any]:
    """Arguments of the reference in float64, from the float32 inputs that every backend gets."""
    dark = {"emissive": np.zeros((*source.camera.shape, 3), np.float32)}
    given = dark | dict(source) | frame_arguments(source, scene(source, around, white_cd_m2)) | p.arguments() | working
    return {name: _widen(given[name]) for name in inspect.signature(reflections).parameters}


def _widen(value: Any) -> Any:
    return value.astype(np.float64) if getattr(value, "dtype", None) == np.float32 else value


def reference(source: GBuffer, working: Planes, p: ReflectionsParams | None = None) -> dict[str, NDArray[np.float64]]:
    return reflections(**arguments(source, white(), p or ReflectionsParams(), working))


def wet(source: GBuffer, where: NDArray[np.bool_]) -> Planes:
    """Puddles somewhere, all of the surroundings in view."""
    shape = source.camera.shape
    return {
        "puddle": where.astype(np.float32),
        "wetness": np.zeros(shape, np.float32),
        "occlusion": np.ones(shape, np.float32),
    }


def wall_over_a_mirror(width: int = 160, height: int = 120, ahead: float = 0.0, shine: float = 1.0) -> GBuffer:
    """A level floor of perfect mirror, and a wall across it with a picture: sines of its own metres; no sky."""
    f = 1.1 * width
    K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2 + 0.3], [0, 0, 1]])
    pose = LEVEL.copy()
    pose[2, 3] -= ahead
    camera = Camera(width=width, height=height, K=K, camera_to_world=pose)
    ray = camera.rays()
    to_wall = WALL - ahead
    to_floor = EYE_HEIGHT / np.maximum(ray[..., 1], 1e-9)
    floor = to_floor < to_wall
    depth = np.where(floor, to_floor, to_wall)
    normal = np.where(floor[..., None], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0])
    size = camera.shape
    rgb = np.where(floor[..., None], 1.0, painted(camera.unproject(depth)))
    planes = {
        "rgb": rgb.astype(np.float32),
        "depth": depth.astype(np.float32),
        "normal": normal.astype(np.float32),
        "albedo": np.full((*size, 3), shine, np.float32),
        "roughness": np.where(floor, 0.0, 1.0).astype(np.float32),
        "metallic": np.ones(size, np.float32),
        "sky": np.zeros(size, np.bool_),
    }
    return GBuffer(planes, camera=camera, time=0.0)


def painted(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is painted on the wall, by camera-frame points, in three colours."""
    x, up = points[..., 0], EYE_HEIGHT - points[..., 1]
    return np.stack([0.5 + 0.4 * np.sin(2 * x), 0.5 + 0.4 * np.sin(3 * up), np.full_like(x, 0.3)], axis=-1)


def floor_of(source: GBuffer) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = source["normal"][..., 1] < -0.5
    return found


def test_a_mirror_floor_shows_the_walls_mirror_image() -> None:
    """Against the picture that the mirror's geometry gives, where the wall's place is in view: within a pixel."""
    source = wall_over_a_mirror()
    floor, camera = floor_of(source), source.camera
    shown = reference(source, wet(source, floor))["rgb"]
    ray = camera.rays()
    image = ray * WALL  # of the wall, seen through the floor as through a window
    up = -(EYE_HEIGHT - image[..., 1])  # [m] over the floor of the place on the wall that is mirrored
    seen_at = (EYE_HEIGHT - up) / WALL * camera.K[1, 1] + camera.K[1, 2]
    rows = np.arange(camera.height)[:, None]
    clear = floor & (seen_at > 8) & (rows - camera.K[1, 2] > EYE_HEIGHT / WALL * camera.K[1, 1] + 2)
    columns = np.arange(camera.width)
    clear &= (columns > 10) & (columns < camera.width - 11)
    assert clear.mean() > 0.15
    exact = painted(np.stack([image[..., 0], EYE_HEIGHT - up, image[..., 2]], axis=-1))
    metres = WALL / camera.K[1, 1]  # a pixel's, on the wall
    off = np.abs(shown - exact)[clear]
    # Nothing of the surroundings is left but by the mirror's loss, which rough metal of 1 has none of.
    assert off[:, 0].max() < 0.4 * 2 * metres + 0.02
    assert off[:, 1].max() < 0.4 * 3 * metres + 0.02
    assert off[:, 2].max() < 0.02


def test_what_is_dry_rough_or_sky_stays_bit_for_bit() -> None:
    source = wall_over_a_mirror()
    everywhere = np.ones(source.camera.shape, bool)
    rough = source.with_plane("roughness", np.full(source.camera.shape, 0.5, np.float32))
    sky = source.with_plane("sky", everywhere)
    for frame, where in ((source, ~everywhere), (rough, everywhere), (sky, everywhere)):
        out = reference(frame, wet(frame, where))
        assert np.array_equal(out["rgb"], frame["rgb"])
        assert not out["reflection"].any()
    out = reference(source, wet(source, floor_of(source)))
    assert np.array_equal(out["rgb"][~floor_of(source)], source["rgb"][~floor_of(source)])


def test_where_nothing_is_in_view_nothing_changes() -> None:
    """A mirror under an open sky, and a plane that must not see itself, level or rolled."""
    for roll in (0.0, 0.2):
        source = wall_over_a_mirror()
        turned = source.camera.camera_to_world.copy()
        turned[:3, :3] @= [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
        camera = Camera(width=160, height=120, K=source.camera.K, camera_to_world=turned)
        ray = camera.rays()
        down = -(ray @ turned[1, :3])
        floor = down > 0.01
        planes = dict(source) | {
            "depth": np.where(floor, EYE_HEIGHT / np.maximum(down, 1e-3), 50).astype(np.float32),
            "normal": np.broadcast_to(turned[1, :3], ray.shape).astype(np.float32),
            "roughness": np.zeros(camera.shape, np.float32),
            "sky": ~floor,
        }
        frame = GBuffer(planes, camera=camera, time=0.0)
        out = reference(frame, wet(frame, floor))
        assert np.array_equal(out["rgb"], frame["rgb"])


@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3])
def test_a_white_room_stays_white(roughness: float) -> None:
    source = wall_over_a_mirror()
    size = source.camera.shape
    source = source.with_plane("rgb", np.ones((*size, 3), np.float32))
    source = source.with_plane("roughness", np.full(size, roughness, np.float32))
    for metallic in (0.0, 1.0):
        frame = source.with_plane("metallic", np.full(size, metallic, np.float32))
        out = reference(frame, wet(frame, floor_of(frame)))
        assert out["reflection"].max() > 0.01
        assert np.abs(out["rgb"] - 1).max() < 1e-6


def test_light_is_never_negative() -> None:
    source = wall_over_a_mirror()
    dark = source.with_plane("rgb", np.zeros_like(source["rgb"]))
    out = reference(dark, wet(dark, floor_of(dark)))
    assert out["rgb"].min() >= 0
    assert out["reflection"].min() >= 0


def test_a_hair_breadth_of_camera_moves_the_picture_little() -> None:
    """A twentieth of a pixel at the foot of the picture changes no pixel of the mirror by more than the wall does."""
    first, second = (wall_over_a_mirror(ahead=ahead) for ahead in (0.0, 0.002))
    floor = floor_of(first) & floor_of(second)
    one, two = (reference(frame, wet(frame, floor))["rgb"] for frame in (first, second))
    assert np.abs(one - two)[floor].max() < 0.03


def test_a_lamp_on_rough_ground_is_left_to_its_own_highlight() -> None:
    """What wide lobes see of a wall that shines by itself alone is black."""
    source = wall_over_a_mirror(shine=0.5)
    size = source.camera.shape
    frame = source.with_plane("emissive", source["rgb"]).with_plane("roughness", np.full(size, 0.4, np.float32))
    far = floor_of(source) & (source["depth"] < 8)
    reflecting = frame.with_plane("emissive", np.zeros_like(source["rgb"]))
    lit, lamps = (reference(f, wet(f, floor_of(f)))["reflection"][far] for f in (reflecting, frame))
    black = reflecting.with_plane("rgb", np.zeros_like(source["rgb"]))
    none = reference(black, wet(black, floor_of(black)))["reflection"][far]
    assert (lamps - none).mean() < 0.02 * (lit - none).mean()


def test_what_is_all_but_occluded_fades_out() -> None:
    """Lagarde's share within half of what it fades over, never less, all to the digits, and nothing of nothing."""
    NoV, occlusion, roughness = np.meshgrid(*(np.linspace(0.0, 1.0, 41) for _ in range(3)))
    NoV = np.maximum(NoV, 1e-4)
    shares = specular_occlusion(NoV, occlusion, roughness)
    sharp = (NoV + occlusion) ** np.exp2(-16 * roughness - 1) - 1 + occlusion
    some = occlusion > FADING
    assert np.all(shares[some] >= np.clip(sharp, 0.0, 1.0)[some])
    assert np.all(shares - np.clip(sharp, 0.0, 1.0) <= FADING / 2)
    assert not shares[occlusion == 0].any()
    hair = 1e-7
    moved = specular_occlusion(NoV * (1 + hair), occlusion, roughness)
    assert np.all(np.abs(moved - shares)[some] <= 1.01 * hair / FADING * shares[some])


def test_heights_above_a_ray_are_metres_also_where_a_surface_is_seen_from_behind() -> None:
    """A metre along the height's own direction is a metre of height: the direction has length 1."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(1000, 3))
    u, v = rng.integers(0, 640, 1000), rng.integers(0, 352, 1000)
    ray = Mirrored(
        u, v, np.full(1000, 7.0), normal, np.full(1000, 0.1), 500.0, 480.0, 320.0, 176.0, np.array([0, -1, 0])
    )
    r = np.stack([(u - 320) / 500, (v - 176) / 480, np.ones(1000)], axis=-1)
    off_axis = np.abs(np.einsum("nc,nc->n", ray.n, -ray.view)) < 0.99
    height = ray.above_ray
    x, y = height.by_u * 500, height.by_v * 480
    z = height.at - x * r[:, 0] - y * r[:, 1]
    assert np.allclose(np.sqrt(x**2 + y**2 + z**2)[off_axis], 1, rtol=1e-9)


def test_means_of_rows() -> None:
    """Of one light that light, whatever sky is between; of sky alone what is given."""
    light = np.full((50, 2, 3), 0.7)
    solid = np.random.default_rng(0).random((50, 2)) < 0.7
    solid[:, 1] = False
    y, stride = (i.ravel() for i in np.meshgrid(np.arange(50), np.arange(2, 3 * max(BLOCKS))))
    inside = y + stride <= 50
    y, stride = y[inside], stride[inside]
    own = np.full((len(y), 3), 0.2)
    means = RowMeans(light, solid)
    found = means.around(y, np.zeros_like(y), stride, own)
    assert np.all((np.abs(found - 0.7) < 1e-12) | (found == 0.2))
    assert (found[stride > 9] != 0.2).all()
    assert np.array_equal(means.around(y, np.ones_like(y), stride, own), own)


@cache
def wet_street(size: tuple[int, int], sky: bool | None = None) -> tuple[GBuffer, Planes]:
    """A frame of the street whose road is wet, a fifth of it in puddles with a tilt as of ripples."""
    whole = street.frame(28, width=size[0], height=size[1])
    names = ("rgb", "depth", "normal", "albedo", "roughness", "metallic", "emissive", "sky")
    rng = np.random.default_rng(0)
    v, u = np.indices(whole.camera.shape)
    puddle = np.where(whole["road"], np.clip(np.sin(u / 9) + np.sin(v / 4) - 0.7, 0, 1), 0).astype(np.float32)
    tilted = whole["normal"] + (puddle[..., None] * rng.normal(size=whole["normal"].shape) * 0.03)
    tilted /= np.linalg.norm(tilted, axis=-1, keepdims=True)
    roughness = np.where(whole["road"], 0.3 * (1 - puddle), whole["roughness"]).astype(np.float32)
    planes = {n: whole[n] for n in names} | {"normal": tilted.astype(np.float32), "roughness": roughness}
    if sky is not None:
        planes["sky"] = np.full(whole.camera.shape, sky)
    source = GBuffer(planes, camera=whole.camera, time=0.0)
    light = dict(source) | frame_arguments(source, scene(source, overcast(), WHITE)) | AmbientParams().arguments()
    lit = ambient(**{name: _widen(light[name]) for name in inspect.signature(ambient).parameters})
    working = {
        "puddle": puddle,
        "wetness": whole["road"].astype(np.float32),
        "occlusion": lit["occlusion"].astype(np.float32),
    }
    return source.with_plane("rgb", lit["rgb"].astype(np.float32)), working


def on(
    backend: OpenCLBackend, source: GBuffer, working: Planes, around: Environment, layers: tuple[str, ...]
) -> dict[str, NDArray[np.float32]]:
    """What an OpenCL backend makes of it."""
    planes = backend.upload(source, scene(source, around, WHITE), layers)
    for key, values in working.items():
        room = planes.pitch - values.shape[1]
        planes.buffers[key] = backend._to_device(key, np.pad(values, ((0, 0), (0, room)), mode="edge"))
    backend.run("reflections", planes, ReflectionsParams())
    return backend.download(planes, ["rgb", *layers])


@cache
def truth(case: str, size: tuple[int, int], sky: bool | None = None) -> tuple[GBuffer, Planes, dict[str, Any]]:
    """Inputs and the reference's answer, once for all backends."""
    source, working = hard(case, size) if case in HARD else wet_street(size, sky)
    return source, working, reflections(**arguments(source, overcast(), ReflectionsParams(), working, WHITE))


@cache
def overcast() -> Environment:
    return environment(AmbientParams(preset="overcast"))


HARD = ("noise", "spikes", "flat", "zero normals")


def hard(case: str, size: tuple[int, int]) -> tuple[GBuffer, Planes]:
    """Random depths and normals; a level floor with depth spikes; one depth for all; no normals."""
    ragged = lit_inputs.frame(*size, rgb=np.random.default_rng(3).random((*size[::-1], 3), dtype=np.float32))
    if case == "spikes":
        source = wall_over_a_mirror(*size)
        source = GBuffer(dict(source) | {"emissive": 0 * source["rgb"]}, camera=source.camera, time=0.0)
        depth = source["depth"].copy()
        depth[::5, ::7] = 1.0
        depth[::6, ::4] = 1e4
        source = source.with_plane("depth", depth)
    elif case == "flat":
        source = ragged.with_plane("depth", np.full(size[::-1], 10.0, np.float32))
    elif case == "zero normals":
        source = lit_inputs.unchecked(ragged, normal=np.zeros_like(ragged["normal"]))
    else:
        source = ragged
    return source, wet(source, ~source["sky"])


def check(backend: OpenCLBackend, case: str, size: tuple[int, int], sky: bool | None = None) -> None:
    """The error bar on the picture, with the layer and without.

    On random normals the layer is told by the picture that it is a part of: where a ramp begins, it all but vanishes.
    """
    source, working, expected = truth(case, size, sky)
    for layers in ((), ("reflection",)):
        for name, found in on(backend, source, working, overcast(), layers).items():
            assert np.isfinite(found).all(), name
            assert (found >= 0).all(), name
            picture = expected["rgb"] - expected[name] if case in HARD else 0.0
            largest, p9999 = error(found + picture, expected[name] + picture)
            assert largest <= BAR_MAX, f"{case}, {name}: {largest:.2e}"
            assert p9999 <= BAR_P9999, f"{case}, {name}: {p9999:.2e}"


def test_kernel_matches_reference(opencl_backend: OpenCLBackend) -> None:
    check(opencl_backend, "street", (320, 176))


@pytest.mark.parametrize("case", HARD)
def test_kernel_matches_reference_on_hard_inputs(opencl_backend: OpenCLBackend, case: str) -> None:
    check(opencl_backend, case, (131, 67))


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    for sky in (None, True, False):
        check(opencl_backend, "street", size, sky)
