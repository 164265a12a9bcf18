"""Ambient light: energy, shadows against the street's exact ones, and every kernel against the reference."""

from __future__ import annotations

import inspect
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, distance_transform_edt

from aw4d import street
from aw4d.backend import frame_arguments
from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.environment import Environment, arrays, environment
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import in_camera
from aw4d.params import AmbientParams
from aw4d.passes import PASSES
from aw4d.scene import Scene
from reference_numpy.ambient import ambient
from tests.lit_inputs import frame as random_frame

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

RESULTS = ("rgb", "ambient", "shadow", "occlusion")
SIZES = [(1, 1), (1, 9), (9, 1), (13, 7), (16, 3), (17, 3), (33, 2), (129, 5)]


@cache
def surroundings(preset: str) -> Environment:
    """A preset's environment; the sun, where there is one, in the built-in street's place."""
    around = environment(AmbientParams(preset=preset))  # type: ignore[arg-type]
    return around


def scene(source: GBuffer, around: Environment) -> Scene:
    """No lamps, white at 5,000 cd/m2."""
    tables = arrays(around, source.camera, 5_000).arguments()
    return Scene(lights=in_camera([], source.camera), environment=tables)


def reference(source: GBuffer, around: Environment, p: AmbientParams) -> dict[str, NDArray[np.float64]]:
    """The definition of the result."""
    given = dict(source) | frame_arguments(source, scene(source, around)) | p.arguments()
    return ambient(**{name: _widen(given[name]) for name in inspect.signature(ambient).parameters})


def _widen(value: Any) -> Any:
    return value.astype(np.float64) if getattr(value, "dtype", None) == np.float32 else value


@cache
def drawn(width: int = 240, height: int = 132, index: int = 28) -> GBuffer:
    """A frame of the street with the planes that the pass reads."""
    whole = street.frame(index, width=width, height=height)
    return GBuffer({n: whole[n] for n in ("rgb", *PASSES["ambient"].reads)}, camera=whole.camera, time=0.0)


@cache
def uniform() -> Environment:
    """Radiance 1 from everywhere, no sun."""
    white = np.full((64, 128, 3), 5_000.0)
    nowhere = np.array([0.0, 1.0, 0.0])
    return Environment(radiance=white, backdrop=white, sun_direction=nowhere, sun_irradiance=np.zeros(3))


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.7, 1.0])
def test_a_white_room_is_white(roughness: float, metallic: float) -> None:
    """White furnace: what is white in white surroundings cannot be told from them, at any angle."""
    source = random_frame(32, 18)
    size = source.camera.shape
    source = source.with_plane("albedo", np.ones((*size, 3), np.float32))
    source = source.with_plane("roughness", np.full(size, roughness, np.float32))
    source = source.with_plane("metallic", np.full(size, metallic, np.float32))
    rgb = reference(source, uniform(), AmbientParams(occlusion_steps=0))["rgb"]
    assert rgb.max() <= 1 + 1e-3
    assert rgb.min() > 0.999


def test_a_plane_neither_occludes_nor_shadows_itself() -> None:
    camera = drawn().camera
    ray = camera.rays()
    up = -camera.camera_to_world[1, :3]
    height = 1.6 / np.maximum(ray @ up, 1e-3)
    ground = ray @ up > 0.02
    depth = np.where(ground, height, 80).astype(np.float32)
    size = camera.shape
    planes = {
        "depth": depth,
        "normal": np.broadcast_to(-up, (*size, 3)).astype(np.float32),
        "albedo": np.full((*size, 3), 0.3, np.float32),
        "roughness": np.full(size, 0.9, np.float32),
        "metallic": np.zeros(size, np.float32),
        "sky": ~ground,
    }
    out = reference(GBuffer(planes, camera=camera, time=0.0), surroundings("noon"), AmbientParams())
    assert out["shadow"][ground].min() > 0.999
    assert out["occlusion"][ground].min() > 0.99


def test_no_surroundings_no_light_and_twice_the_surroundings_twice_the_light() -> None:
    source, p = drawn(), AmbientParams()
    once, twice = (
        reference(source, environment(AmbientParams(preset="noon", strength=s)), p)["rgb"] for s in (1.0, 2.0)
    )
    assert np.allclose(twice, 2 * once, rtol=1e-5)


def test_shadow_edges_lie_where_the_street_has_them() -> None:
    """On road and pavement, of things that the picture shows: the median edge within 2 pixels of the exact one."""
    index = 28
    source = drawn(640, 352, index)
    around = environment(AmbientParams(preset="noon"))
    towards = source.camera.camera_to_world[:3, :3].T @ street.sun_direction
    given = scene(source, around)
    tables = dict(given.environment) | {"sun_direction": towards.astype(np.float32)}
    arguments = dict(source) | frame_arguments(source, Scene(lights=given.lights, environment=tables))
    arguments |= AmbientParams().arguments()
    found = ambient(**{name: _widen(arguments[name]) for name in inspect.signature(ambient).parameters})["shadow"] < 0.5
    exact = street.shadow(index, width=640, height=352)
    level = (source["normal"] @ source.camera.camera_to_world[1, :3] > 0.9) & ~source["sky"] & (source["depth"] < 40)
    edge = level & exact & binary_dilation(~exact & level)
    mine = found & binary_dilation(~found)
    # An edge whose caster the picture does not show has no counterpart anywhere near.
    distance = distance_transform_edt(~mine)[edge]
    seen = distance < 12
    assert seen.mean() > 0.3
    assert np.median(distance[seen]) <= 2


@cache
def lit_street(preset: str, size: tuple[int, int], sky: bool | None) -> tuple[GBuffer, Scene, dict[str, Any]]:
    """A frame of the street, all of it sky or nothing where `sky` is given; its light; the reference, once for all."""
    source, around = drawn(*size), surroundings(preset)
    if sky is not None:
        source = source.with_plane("sky", np.full_like(source["sky"], sky))
    return source, scene(source, around), reference(source, around, AmbientParams())


def check(backend: OpenCLBackend, preset: str, size: tuple[int, int], sky: bool | None = None) -> None:
    """The error bar on the picture and on every layer."""
    source, light, truth = lit_street(preset, size, sky)
    planes = backend.upload(source, light, RESULTS[1:])
    backend.run("ambient", planes, AmbientParams())
    for name, found in backend.download(planes, RESULTS).items():
        assert np.isfinite(found).all(), name
        assert (found >= 0).all(), name
        largest, p9999 = error(found, truth[name])
        assert largest <= BAR_MAX, f"{name}: {largest:.2e}"
        assert p9999 <= BAR_P9999, f"{name}: {p9999:.2e}"


@pytest.mark.parametrize("preset", ["noon", "golden_hour", "overcast", "midnight"])
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, preset: str) -> None:
    check(opencl_backend, preset, (240, 132))


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    for sky in (None, True, False):
        check(opencl_backend, "overcast", size, sky)
