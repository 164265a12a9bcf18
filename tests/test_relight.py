"""Relit weathers end to end on the built-in street: light is where it is sent, and a frame is a pure function."""

from __future__ import annotations

import dataclasses
import logging
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.ingest import ingest_street
from aw4d.io.images import write_png
from aw4d.lighting import metered_white
from aw4d.params import ExposureParams
from aw4d.pipeline import LIGHT_LAYER, Plan, each_light, plan, prepare, render
from aw4d.render import EACH_LIGHT, EDITED_DEPTH, LABELS, edit, with_clip_exposure
from aw4d.world.sizes import rain_extinction, snow_extinction
from reference_numpy.srgb import LUMINANCE

FRAMES, WIDTH, HEIGHT = 4, 160, 88


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """A few small frames of the street."""
    out = tmp_path_factory.mktemp("street") / "street.clip"
    return ingest_street(out, frames=FRAMES, width=WIDTH, height=HEIGHT, workers=1)


def picture(clip: Clip, weather: str, index: int = 1, *sets: str) -> NDArray[np.float32]:
    """A frame on NumPy, scene-linear."""
    return next(edit(clip, weather, backend="numpy", frames=[index], assignments=sets)).rgb


def test_at_night_the_sky_is_dark_and_the_beam_lies_on_the_asphalt(street: Clip) -> None:
    frame, night = street.frame(1), picture(street, "night") @ LUMINANCE
    source = frame["rgb"] @ LUMINANCE
    assert np.median(night[frame["sky"]]) < 0.02 < 0.2 < np.median(source[frame["sky"]])  # but for lamps before it
    dark = picture(street, "night", 1, "headlights.on=off") @ LUMINANCE
    beam = night - dark
    ahead = frame["road"] & (np.abs(np.arange(WIDTH) - WIDTH / 2) < WIDTH / 8) & (frame["depth"] < 15)
    assert beam[ahead].mean() > 0.05
    assert (beam >= -1e-6).all()
    assert beam[frame["sky"]].max() == 0


def test_overcast_has_no_shadow_of_the_sun(street: Clip) -> None:
    layers = next(edit(street, "overcast", backend="numpy", frames=[1], layers=["shadow", "occlusion"])).layers
    assert (layers["shadow"] == 1).all()
    assert 0.5 < layers["occlusion"].mean() < 1
    noon = next(edit(street, "overcast", backend="numpy", frames=[1], assignments=NOON, layers=["shadow"])).layers
    assert 0.02 < 1 - noon["shadow"].mean() < 0.9


NOON = ["ambient.preset=noon"]


def test_a_higher_sun_is_brighter_on_the_road_at_the_same_exposure(street: Clip) -> None:
    road = street.frame(1)["road"]
    fixed = ["ambient.preset=noon", "exposure.white_cd_m2=30000"]
    low, high = (
        picture(street, "overcast", 1, *fixed, f"ambient.sun_altitude_deg={altitude}")[road].mean()
        for altitude in (15, 60)
    )
    assert high > 2 * low


def test_each_light_alone_adds_up_to_all_of_them(street: Clip) -> None:
    made, backend = plan(street, "night"), NumpyBackend()
    frame = prepare(street.frame(1, made.planes), made, 1)
    alone = each_light(backend, frame, made, 1)
    assert {name.removeprefix(LIGHT_LAYER) for name in alone} <= {light.name for light in made.lighting.lights(1)}
    assert "light-ego-left" in alone
    planes = backend.upload(frame, made.scene(1))
    step = next(step for step in made.steps if step.name == "spot_lights")
    backend.run("spot_lights", planes, step.params)
    direct = planes.arrays["direct"] - frame["emissive"]
    assert np.allclose(sum(alone.values()), direct, rtol=1e-4, atol=1e-5 * direct.max())


def test_lamps_are_switched_by_group_and_by_name(street: Clip) -> None:
    every = {light.name for light in plan(street, "night").lighting.lights(1)}
    assert {"ego-left", "ego-right"} < every
    assert any(name.startswith("street-") for name in every)
    dark = {light.name for light in plan(street, "night", ["lights.street=off"]).lighting.lights(1)}
    assert dark == {name for name in every if not name.startswith("street-")}
    one = {light.name for light in plan(street, "night", ["lights.off=ego-left"]).lighting.lights(1)}
    assert every - one == {"ego-left"}


def test_moving_cars_shine_and_parked_ones_do_not(street: Clip) -> None:
    info = street.info
    names = {light.name for light in plan(street, "night").lighting.lights(1)}
    for box in street.boxes(1):
        track = [b.object_to_world[:3, 3] for boxes in info.boxes for b in boxes if b.track_id == box.track_id]
        moves = float(np.linalg.norm(track[-1] - track[0])) > 1
        assert any(name.startswith(f"vehicle-{box.track_id}-") for name in names) == moves


@pytest.mark.parametrize("weather", ["night", "overcast", "dawn", "dusk", "fog"])
def test_a_frame_alone_is_the_frame_of_the_whole_run(street: Clip, weather: str) -> None:
    whole = [frame.rgb for frame in edit(street, weather, backend="numpy", frames=range(3))]
    backwards = [frame.rgb for frame in edit(street, weather, backend="numpy", frames=[2, 1])]
    assert np.array_equal(whole[2], backwards[0])
    assert np.array_equal(whole[1], backwards[1])
    assert np.isfinite(whole[0]).all()
    assert (whole[0] >= 0).all()


def test_a_steady_exposure_does_not_depend_on_the_frames_asked_for(street: Clip) -> None:
    made, backend = plan(street, "night", ["night_grade.steady=on"]), NumpyBackend()
    fixed = with_clip_exposure(street, made, backend)
    luminance = fixed.settings.night_grade.luminance
    assert luminance is not None
    assert luminance > 0
    assert made.settings.night_grade.luminance is None
    assert with_clip_exposure(street, fixed, backend) is fixed
    plain = plan(street, "night")
    assert with_clip_exposure(street, plain, backend) is plain


def test_metered_white() -> None:
    assert metered_white(1e5, ExposureParams()) == pytest.approx(1e5 / math.pi)
    assert metered_white(0.5, ExposureParams()) == ExposureParams().darkest_white_cd_m2
    assert metered_white(1e5, ExposureParams(ev=1)) == pytest.approx(1e5 / math.pi / 2)
    assert metered_white(1e5, ExposureParams(white_cd_m2=7)) == 7


def test_frames_of_another_renderer_stand_in_for_the_ambient_light(street: Clip, tmp_path: Path) -> None:
    for index in range(FRAMES):
        write_png(tmp_path / f"{index:04d}.png", np.full((HEIGHT, WIDTH, 3), 10 * index, np.uint8))
    sets = [f"ambient.frames={tmp_path}", "headlights.on=off", "lights.street=off", "lights.vehicles=off"]
    made = plan(street, "dusk", sets)
    assert "ambient" in made.skipped
    rendered = next(edit(street, "dusk", backend="numpy", frames=[2], assignments=sets))
    plain = street.frame(2)["emissive"].max(axis=-1) == 0
    assert (rendered.image[plain] == 20).all()
    write_png(tmp_path / "0001.png", np.zeros((HEIGHT, WIDTH + 1, 3), np.uint8))
    with pytest.raises(InputError, match=r"0001\.png"):
        picture(street, "dusk", 1, *sets)


def test_layers_of_lights_come_with_the_frame(street: Clip) -> None:
    frame = next(edit(street, "night", backend="numpy", frames=[1], layers=["ambient", EACH_LIGHT]))
    assert {"ambient", "light-ego-left", "light-ego-right"} <= set(frame.layers)
    assert frame.layers["light-ego-left"].shape == (HEIGHT, WIDTH, 3)


def test_traffic_lights_stay_bright_at_night(street: Clip) -> None:
    for index in range(FRAMES):
        frame = street.frame(index)
        green = frame["emissive"].max(axis=-1) > 0.2
        if green.any():
            night = picture(street, "night", index, "headlights.on=off")
            assert (night[green].max(axis=-1) >= 0.9 * frame["emissive"][green].max(axis=-1)).all()
            off = picture(street, "night", index, "headlights.on=off", "lights.traffic=off")
            assert off[green].max() < night[green].max()


def standing(made: Plan, index: int) -> Plan:
    """The same with a camera and boxes that stay for all frames where they are in one."""
    info = made.lighting.info
    K, pose = (np.repeat(values[[index]], len(info), axis=0) for values in (info.K, info.camera_to_world))
    still = dataclasses.replace(info, K=K, camera_to_world=pose, boxes=[info.boxes[index]] * len(info))
    return dataclasses.replace(made, lighting=dataclasses.replace(made.lighting, info=still))


def later_and_now(street: Clip, weather: str, *sets: str) -> list[dict[str, NDArray[np.float32]]]:
    """Picture and puddles of a scene that stands still, at two times."""
    made = standing(plan(street, weather, ["lights.vehicles=off", *sets]), 1)
    layers = [layer for layer in ("puddle",) if layer in made.layers]
    still = street.frame(1, made.planes)
    return [render(NumpyBackend(), still, made, index, layers) for index in (0, 3)]


def test_what_falls_is_haze_in_the_plan(street: Clip) -> None:
    clear, dense = (plan(street, "rain", [f"rain.rate_mm_h={rate}"]).settings.fog.extinction for rate in (0, 25))
    assert dense - clear == pytest.approx(rain_extinction(25))
    assert plan(street, "snow").settings.fog.extinction == pytest.approx(clear + snow_extinction(1.5))


def test_clouds_are_seen_through_rain(street: Clip) -> None:
    grey, blue = (
        picture(street, "rain", 1, *FALLING, f"overcast_sky.tint={tint}") for tint in ("0.6,0.6,0.6", "0.3,0.6,0.9")
    )
    sky = street.frame(1)["sky"]
    assert (blue[sky][:, 2] / blue[sky][:, 0]).mean() > 1.1 * (grey[sky][:, 2] / grey[sky][:, 0]).mean()


def test_the_edited_depth_has_flakes_and_snow(street: Clip) -> None:
    sets = ["snow_cover.displacement=on", "snow.depth_cm=50", "snow.rate_mm_h=20"]
    frame = next(edit(street, "snow", backend="numpy", frames=[1], assignments=sets, layers=[LABELS]))
    source = street.frame(1)
    assert "flake_depth" not in frame.layers
    assert np.array_equal(frame.layers["depth"], source["depth"])
    nearer = frame.layers[EDITED_DEPTH] < source["depth"]
    assert nearer[source["sky"]].any()
    assert nearer[~source["sky"]].mean() > 0.2
    assert not (frame.layers[EDITED_DEPTH] > source["depth"]).any()


def test_what_changes_nothing_is_said(street: Clip, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="aw4d"):  # an earlier --quiet may have silenced it
        plan(street, "night", ["rain.rate_mm_h=20", "headlights.on=off"])
    assert [record.getMessage() for record in caplog.records] == [
        "--set rain.rate_mm_h=20 changes nothing: night has no rain"
    ]


FALLING = ("rain_streaks.rate_mm_h=0", "snow_fall.rate_mm_h=0")


@pytest.mark.parametrize("weather", ["night", "overcast", "dawn", "fog", "snow", "rain+night"])
def test_a_scene_that_stands_still_does_not_flicker(street: Clip, weather: str) -> None:
    first, later = later_and_now(street, weather, *FALLING, "ripples.rate_mm_h=0")
    assert np.array_equal(first["rgb"], later["rgb"])


def test_of_a_wet_road_nothing_but_puddles_moves(street: Clip) -> None:
    first, later = later_and_now(street, "rain", *FALLING, "rain.rate_mm_h=25", "wet_ground.wetness=0.3")
    moved = (first["rgb"] != later["rgb"]).any(axis=-1)
    assert moved.any()
    assert not moved[first["puddle"] == 0].any()
