"""What is left out is left out without error or within its bound, and an explanation says how much that is."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rich.console import Console

from aw4d.backend import Backend
from aw4d.backend_numpy import NumpyBackend
from aw4d.clip import Clip
from aw4d.considered import counts
from aw4d.explain import Explanation, explain, show
from aw4d.gbuffer import GBuffer
from aw4d.ingest import ingest, ingest_street
from aw4d.pipeline import Plan, Step, plan, render
from aw4d.weathers import ORDER
from tests import made_up

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from aw4d.backend_opencl import OpenCLBackend

SLICES = "ambient.occlusion_slices"
WEATHERS = ("snow", "rain", "fog", "overcast", "night", "rain+night", "snow+fog")
DARK = ("headlights.on=off", "lights.street=off", "lights.vehicles=off")
# A weather and what leaves its passes nothing to do, and the passes that are not run then.
IDLE = {
    "no extinction": ("fog", ["fog.sigma_s=0"], {"fog"}),
    "no snow on the ground": ("snow", ["snow_cover.depth_cm=0"], {"snow_cover"}),
    "nothing wet": ("snow", ["wet_ground.wetness=0"], {"wet_ground"}),
    "no puddles": ("rain", ["puddles.share=0"], {"puddles", "ripples"}),
    "no ripples": ("rain", ["ripples.rate_mm_h=0"], {"ripples"}),
    "nothing mirrors": (
        "rain",
        ["puddles.share=0", "wet_ground.wetness=0"],
        {"puddles", "ripples", "wet_ground", "reflections"},
    ),
    "no flakes": ("snow", ["snow_fall.rate_mm_h=0"], {"snow_fall"}),
    "no drops": ("rain", ["rain_streaks.rate_mm_h=0"], {"rain_streaks"}),
    "no lights": ("fog", list(DARK), {"spot_lights", "harmonize"}),
}


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    path = tmp_path_factory.mktemp("explain") / "street.aw4d"
    ingest_street(path, frames=3, width=160, height=88, workers=1)
    return Clip(path)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """A clip in which nothing shines by itself."""
    path = tmp_path_factory.mktemp("explain") / "plain.aw4d"
    clip = ingest(made_up.source(2), path)
    clip.planes = tuple(name for name in clip.planes if name != "emissive")
    return clip


def _with_all_passes(clip: Clip, made: Plan) -> Plan:
    """The plan with every pass put back that it leaves out; all planes are read."""
    steps = [*made.steps, *(Step(name=name, params=getattr(made.settings, name)) for name in made.skipped)]
    in_order = tuple(sorted(steps, key=lambda step: ORDER.index(step.name)))
    return dataclasses.replace(made, steps=in_order, planes=tuple(clip.planes))


def _picture(backend: Backend, clip: Clip, made: Plan) -> NDArray[np.float32]:
    return render(backend, clip.frame(1, made.planes), made, 1)["rgb"]


@pytest.mark.parametrize("case", IDLE)
def test_a_pass_that_is_not_run_would_change_no_bit(opencl_device: OpenCLBackend, plain: Clip, case: str) -> None:
    weather, sets, idle = IDLE[case]
    made = plan(plain, weather, sets)
    assert set(made.skipped) == idle
    for backend in (NumpyBackend(), opencl_device):
        without, with_all = (_picture(backend, plain, each) for each in (made, _with_all_passes(plain, made)))
        assert np.array_equal(without, with_all), backend.name


@pytest.mark.parametrize("weather", ["snow+fog", "rain+night"])
def test_nothing_of_the_sky_but_its_picture_counts(opencl_device: OpenCLBackend, street: Clip, weather: str) -> None:
    made = plan(street, weather)
    frame = street.frame(1, made.planes)
    sky = frame["sky"]
    rng = np.random.default_rng(0)
    other = {
        "albedo": rng.random((*sky.shape, 3), dtype=np.float32),
        "roughness": rng.random(sky.shape, dtype=np.float32),
        "metallic": rng.random(sky.shape, dtype=np.float32),
    }
    changed: GBuffer = frame
    for name, values in other.items():
        at = sky[..., None] if values.ndim == 3 else sky
        changed = changed.with_plane(name, np.where(at, values, frame[name]))
    for backend in (NumpyBackend(), opencl_device):
        one, two = (render(backend, each, made, 1)["rgb"] for each in (frame, changed))
        assert np.array_equal(one, two), backend.name


@pytest.mark.parametrize("weather", ["rain", "snow"])
def test_lamps_left_out_of_the_air_stay_under_their_bound(street: Clip, weather: str) -> None:
    made, all_of_them = plan(street, weather), plan(street, weather, ["fog.faintest=0"])
    (air,) = (count for count in counts(street, made, NumpyBackend(), 1) if count.step == "fog")
    assert air.evaluated < air.considered
    off = np.abs(_picture(NumpyBackend(), street, made) - _picture(NumpyBackend(), street, all_of_them))
    assert off.max() <= 1.1 * air.considered * made.settings.fog.faintest


@pytest.mark.parametrize("weather", WEATHERS)
def test_counts_are_the_same_on_every_backend(opencl_device: OpenCLBackend, street: Clip, weather: str) -> None:
    made = plan(street, weather)
    here, there = (counts(street, made, backend, 1) for backend in (NumpyBackend(), opencl_device))
    assert all(0 <= count.evaluated <= count.considered for count in (*here, *there))
    by_planes = {(count.step, count.what): count for count in here if "pixels" in count.what}
    seen = {(count.step, count.what): count for count in there}
    for key, count in by_planes.items():
        assert count.considered == seen[key].considered
        assert abs(count.evaluated - seen[key].evaluated) <= 2e-3 * count.considered, key  # ramps that end at 0


def test_particles_and_tiles_are_those_of_the_kernels(opencl_device: OpenCLBackend, street: Clip) -> None:
    found = {(count.step, count.what): count for count in counts(street, plan(street, "rain+night"), opencl_device, 1)}
    drops = found["rain_streaks", "particles of the box that show"]
    assert 0 < drops.evaluated < drops.considered
    tiles, pairs = found["spot_lights", "tiles with a light"], found["spot_lights", "lights of all tiles"]
    assert tiles.considered == 10 * 6
    assert 0 < tiles.evaluated <= pairs.evaluated < pairs.considered
    assert pairs.considered == tiles.considered * found["spot_lights", "lights that reach a tile"].considered


def _explained(clip: Clip, backend: Backend, weather: str, quality: str) -> Explanation:
    return explain(clip, plan(clip, weather, quality=quality), backend, range(len(clip)))


def test_an_explanation_has_every_pass_and_what_errs(opencl_device: OpenCLBackend, street: Clip) -> None:
    made = plan(street, "rain+night", ["ripples.rate_mm_h=0"], "fast")
    found = explain(street, made, opencl_device, range(len(street)))
    assert found.frames == (0, 1, 2)
    assert list(found.ms) == [step.name for step in made.steps]
    assert all(ms > 0 for ms in found.ms.values())
    assert found.skipped == {"ripples": "rate_mm_h is 0"}
    nodes, slices = (next(a for a in found.approximations if a.parameter == key) for key in ("fog.nodes", SLICES))
    assert (nodes.value, nodes.exact) == (4, 64)
    assert nodes.max_codes >= nodes.p9999_codes > 0
    assert slices.value < slices.exact


def test_the_exact_quality_errs_in_nothing(opencl_device: OpenCLBackend, street: Clip) -> None:
    assert _explained(street, opencl_device, "fog", "exact").approximations == ()


def test_an_explanation_is_shown(plain: Clip) -> None:
    made = plan(plain, "fog", ["fog.sigma_s=0"])
    console = Console(record=True, width=160)
    show(made, explain(plain, made, NumpyBackend(), [1]), console)
    text = console.export_text()
    for word in ("fog, balanced; looked at: frames 1", "the extinction is 0", "ambient", "pixels that are no sky"):
        assert word in text


def test_explaining_changes_no_frame(street: Clip) -> None:
    made, backend = plan(street, "night"), NumpyBackend()
    before = _picture(backend, street, made)
    explain(street, made, backend, [1])
    assert np.array_equal(before, _picture(backend, street, made))
