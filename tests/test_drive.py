"""The whole way on a real recording: a KITTI drive becomes a clip, the clip a foggy one, on every backend alike."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.clip import Clip
from aw4d.compare import BAR_MAX, BAR_P9999, VECTORS, error
from aw4d.gbuffer import GBuffer
from aw4d.ingest import ingest
from aw4d.io.kitti import open_kitti
from aw4d.lights.light import Light
from aw4d.params import FogParams
from aw4d.passes import PASSES
from aw4d.pipeline import Plan, plan, prepare
from aw4d.render import edit
from aw4d.weathers import WEATHERS
from tests.fog_inputs import inherent_error
from tests.kitti_scan import CAR, ROAD, SKY, label_iou
from tests.test_fog import check

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

pytestmark = pytest.mark.clip
NUMBERS = (20, 40, 60)  # frames of the drive; 20 and 40 have human labels
FOG = ["fog.visibility_m=60"]


@pytest.fixture(scope="session")
def kitti_clip(kitti_drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """A clip of three frames of the drive, with its boxes."""
    copy = tmp_path_factory.mktemp("kitti") / "2011_09_26" / kitti_drive.name
    for part, suffix in (("image_02", "png"), ("velodyne_points", "bin"), ("oxts", "txt")):
        (copy / part / "data").mkdir(parents=True)
        for number in NUMBERS:
            name = f"{number:010d}.{suffix}"
            (copy / part / "data" / name).symlink_to(kitti_drive / part / "data" / name)
        (copy / part / "timestamps.txt").symlink_to(kitti_drive / part / "timestamps.txt")
    for path in kitti_drive.parent.glob("calib_*.txt"):
        (copy.parent / path.name).symlink_to(path)
    source = open_kitti(copy, labels=kitti_drive / "label_02_0003.txt")
    return ingest(source, copy.parent.parent / "clip", workers=1)


class Truth:
    """A frame of the clip in a weather as NumPy has it: the frame, the plan, and what every step wrote, each from what
    the one before wrote, rounded to float32."""

    def __init__(self, clip: Clip, weather: str, index: int) -> None:
        self.made: Plan = plan(clip, weather, FOG if weather == "fog" else [])
        self.frame = prepare(clip.frame(index, self.made.planes), self.made, index)
        self.scene = self.made.scene(index)
        self.lights = self.made.lighting.lights(index)
        backend = NumpyBackend()
        planes = backend.upload(self.frame, self.scene)
        self.written = []
        for step in self.made.steps:
            backend.run(step.name, planes, step.params)
            names = [*PASSES[step.name].writes, *PASSES[step.name].layers]
            self.written.append(backend.download64(planes, names))
            for name in PASSES[step.name].writes:
                backend.put(planes, name, planes.arrays[name].astype(np.float32))


TOGETHER = ("rain+night", "snow+fog")


@lru_cache(maxsize=len(WEATHERS) + len(TOGETHER))
def truth_of(clip: Clip, weather: str) -> Truth:
    """Frame 20 of the drive in a weather, computed once."""
    return Truth(clip, weather, 0)


@pytest.mark.parametrize(("index", "number"), [(0, 20), (1, 40)])
@pytest.mark.parametrize(
    ("plane", "label", "least"), [("sky", SKY, 0.90), ("road", ROAD, 0.80), ("vehicle", CAR, 0.75)]
)
def test_masks_of_the_clip(
    kitti_clip: Clip, kitti_drive: Path, index: int, number: int, plane: str, label: int, least: float
) -> None:
    mask = kitti_clip.frame(index, [plane])[plane] > 0
    assert label_iou(kitti_drive, number, mask, label) >= least


@pytest.mark.parametrize("weather", [*WEATHERS, *TOGETHER])
def test_kernels_match_references_on_the_recording(
    opencl_backend: OpenCLBackend, kitti_clip: Clip, weather: str
) -> None:
    """The error bar on all that every step writes; the fog's in-scatter alone has a test of its own."""
    truth = truth_of(kitti_clip, weather)
    planes = opencl_backend.upload(truth.frame, truth.scene, list(truth.made.layers))
    for step, expected in zip(truth.made.steps, truth.written, strict=True):
        opencl_backend.run(step.name, planes, step.params)
        for name, found in opencl_backend.download(planes, list(expected)).items():
            assert np.isfinite(found).all(), name
            assert name in VECTORS or (found >= 0).all(), name
            if name != "in_scatter":
                largest, p9999 = error(found, expected[name], vectors=name in VECTORS)
                assert largest <= BAR_MAX, f"{step.name}, {name}: {largest:.2e}"
                assert p9999 <= BAR_P9999, f"{step.name}, {name}: {p9999:.2e}"
        for name in PASSES[step.name].writes:
            opencl_backend.put(planes, name, expected[name].astype(np.float32))


@lru_cache(maxsize=1)
def fog_alone(clip: Clip) -> list[tuple[GBuffer, list[Light], FogParams, dict[str, NDArray[np.float64]]]]:
    """Of every frame what the fog takes, and the error that is inherent in it: computed once for all devices."""
    made = plan(clip, "fog", FOG)
    p = made.steps[-1].params
    assert isinstance(p, FogParams)
    frames = [clip.frame(index, ("rgb", "depth", "sky")) for index in range(len(clip))]
    lit = [(frame, made.lighting.lights(index)) for index, frame in enumerate(frames)]
    return [(frame, lights, p, inherent_error(frame, lights, p)) for frame, lights in lit]


def test_fog_alone_matches_on_the_recording(opencl_device: OpenCLBackend, kitti_clip: Clip) -> None:
    """Every layer of the fog, the in-scatter of many cones within what float32 can tell at their edges."""
    for frame, lights, p, inherent in fog_alone(kitti_clip):
        check(opencl_device, frame, lights, p, inherent=inherent)


def test_fog_thickens_with_distance_and_hides_the_sky(kitti_clip: Clip) -> None:
    source = kitti_clip.frame(0)
    dark = [*FOG, "headlights.on=off", "lights.vehicles=off"]
    foggy = next(edit(kitti_clip, "fog", backend="numpy", assignments=dark, layers=["transmittance", "airlight"]))
    T = foggy.layers["transmittance"]
    near, middle, far = (source["depth"] < 10), (source["depth"] > 20) & (source["depth"] < 30), source["depth"] > 50
    assert T[near].mean() > 0.5 > T[middle].mean() > 0.1 > T[far].mean()
    sky = foggy.rgb[source["sky"]]
    assert sky.std(axis=0).max() < 0.02  # nothing of the clouds is left, only fog, and the glow of the beams
    before, after = (image[far & ~source["sky"]].std(axis=0).max() for image in (source["rgb"], foggy.rgb))
    assert after < 0.1 * before


def test_the_ego_beams_light_the_fog_ahead(kitti_clip: Clip) -> None:
    on_, off = (
        next(edit(kitti_clip, "fog", backend="numpy", assignments=[*FOG, f"headlights.on={state}"])).rgb
        for state in ("on", "off")
    )
    glow = (on_ - off).mean(axis=-1)
    height, width = glow.shape
    low_middle = glow[3 * height // 4 :, width // 3 : 2 * width // 3]
    assert low_middle.mean() > 0.05
    assert glow[:, : width // 8].max() < 0.1 * low_middle.mean()  # beams are cones: the sides stay dark
    assert (glow >= 0).all()
