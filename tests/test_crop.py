"""Snow, wet road, puddles and ripples of a crop are those of the whole picture, to the last bit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.camera import Camera
from aw4d.clip import Clip
from aw4d.gbuffer import GBuffer
from aw4d.ingest import ingest_street
from aw4d.passes import PASSES
from aw4d.pipeline import Plan, plan, prepare

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

WIDTH, HEIGHT, FRAME = 128, 72, 1
ON_SURFACES = ("snow_cover", "wet_ground", "puddles", "ripples")
# Left, top, width, height [px]: no side is a multiple of a vector or of a tile.
CROPS = [(0, 0, 128, 72), (7, 5, 93, 61), (33, 38, 61, 34), (1, 40, 127, 1)]


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """Two small frames of the street; u - cx is a float32 in every crop: cx is a multiple of 2^-12 px."""
    out = tmp_path_factory.mktemp("street") / "street.clip"
    clip = ingest_street(out, frames=2, width=WIDTH, height=HEIGHT, workers=1)
    clip.info.K[:, :2, 2] += (505 / 4096, -359 / 4096)
    return clip


def cropped(frame: GBuffer, left: int, top: int, width: int, height: int) -> GBuffer:
    """Part of a frame: the same planes and the same camera, its principal point elsewhere."""
    K = frame.camera.K.copy()
    K[:2, 2] -= (left, top)
    camera = Camera(width=width, height=height, K=K, camera_to_world=frame.camera.camera_to_world)
    part = {name: frame[name][top : top + height, left : left + width] for name in frame}
    return GBuffer(part, camera=camera, time=frame.time)


def surfaces(backend: Any, frame: GBuffer, made: Plan) -> dict[str, NDArray[np.float32]]:
    """What the passes on surfaces make of a frame."""
    planes = backend.upload(frame, made.scene(FRAME))
    for step in made.steps:
        if step.name in ON_SURFACES:
            backend.run(step.name, planes, step.params)
    written = {name for step in made.steps if step.name in ON_SURFACES for name in PASSES[step.name].writes}
    found: dict[str, NDArray[np.float32]] = backend.download(planes, sorted(written))
    return found


def check(backend: Any, street: Clip, weather: str, crop: tuple[int, int, int, int]) -> None:
    made = plan(street, weather)
    whole = prepare(street.frame(FRAME, made.planes), made, FRAME)
    left, top, width, height = crop
    expected = surfaces(backend, whole, made)
    for name, part in surfaces(backend, cropped(whole, *crop), made).items():
        assert np.array_equal(part, expected[name][top : top + height, left : left + width]), name


@pytest.mark.parametrize("crop", CROPS)
@pytest.mark.parametrize("weather", ["snow", "rain"])
def test_reference(street: Clip, weather: str, crop: tuple[int, int, int, int]) -> None:
    check(NumpyBackend(), street, weather, crop)


@pytest.mark.parametrize("crop", CROPS)
@pytest.mark.parametrize("weather", ["snow", "rain"])
def test_kernels(opencl_device: OpenCLBackend, street: Clip, weather: str, crop: tuple[int, int, int, int]) -> None:
    check(opencl_device, street, weather, crop)
