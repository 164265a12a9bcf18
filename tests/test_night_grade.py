"""Night grading: tone, exposure and sky of the reference, and every kernel against it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from aw4d.errors import InputError
from aw4d.params import NightGradeParams
from reference_numpy.night_grade import factors, gain, nearest_rank, sky_weight
from reference_numpy.srgb import LUMINANCE, linear_to_srgb, srgb_to_linear
from tests.grade_inputs import SIZES, check, frame, on, reference

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend
    from aw4d.gbuffer import GBuffer

NIGHT = NightGradeParams()
SETTINGS = {
    "default": NIGHT,
    "paper": NightGradeParams(convention="paper"),
    "mild": NightGradeParams(strength=0),
    "given luminance": NightGradeParams(luminance=0.2),
    "minimum": NightGradeParams(percentile=1, strength=0.3),
    "maximum": NightGradeParams(percentile=100),
    "sky as it is": NightGradeParams(sky_factor=1),
    "black sky": NightGradeParams(sky_factor=0),
    "hard edge": NightGradeParams(sky_dilate_px=0, sky_blur_px=0),
    "wide edge": NightGradeParams(sky_dilate_px=64, sky_blur_px=32, convention="paper"),
}


def graded(source: GBuffer, p: NightGradeParams) -> np.ndarray:
    return reference("night_grade", source, p)["rgb"]


def no_sky(rgb: np.ndarray) -> GBuffer:
    rgb = np.asarray(rgb, dtype=np.float32)
    return frame(rgb.shape[1], rgb.shape[0], rgb=rgb, sky=np.zeros(rgb.shape[:2], dtype=bool))


def ramp(top: float = 1.0) -> GBuffer:
    """4096 greys from 0 up."""
    return no_sky(np.repeat(np.linspace(0, top, 4096, dtype=np.float32).reshape(16, 256, 1), 3, axis=2))


# ---- exposure


@given(
    arrays(np.float64, st.integers(1, 400), elements=st.floats(0, 1e5, width=32)),
    st.integers(1, 100),
)
def test_the_percentile_is_the_nearest_rank(values: np.ndarray, percentile: int) -> None:
    assert nearest_rank(values, percentile) == np.percentile(values, percentile, method="inverted_cdf")


def test_the_gain_is_the_printed_one() -> None:
    assert gain(0.22, 1.0) == pytest.approx(0.78, rel=1e-5)
    assert gain(0.22, 0.0) == pytest.approx(0.98, rel=1e-5)
    assert gain(0.0, 0.5) == pytest.approx(0.88 * 1.6)
    assert gain(1e5, 0.5) == pytest.approx(0.88 * 0.6)


def test_one_lamp_does_not_change_the_exposure() -> None:
    rgb = np.full((9, 9, 3), 0.2)
    without = graded(no_sky(rgb), NIGHT)
    rgb[4, 4] = 1e5
    lamp = graded(no_sky(rgb), NIGHT)
    assert (lamp[4, 4] > without[4, 4]).all()
    assert np.array_equal(np.delete(lamp.reshape(-1, 3), 40, axis=0), np.delete(without.reshape(-1, 3), 40, axis=0))


def _passing_lorry(luminance: float | None) -> float:
    """How much, in codes, a street changes when something dark covers half of the picture in every other frame."""
    rgb = np.full((20, 20, 3), 0.15)
    rgb[:8] = 0.35
    covered = rgb.copy()
    covered[:, :10] = 0.05
    p = NightGradeParams(luminance=luminance)
    first, second = (graded(no_sky(values), p)[:, 10:] for values in (rgb, covered))
    return float(255 * np.abs(linear_to_srgb(first) - linear_to_srgb(second)).max())


def test_a_given_luminance_does_not_flicker() -> None:
    assert _passing_lorry(None) > 20
    assert _passing_lorry(0.22) == 0


def test_the_frames_own_luminance_evens_out_a_flickering_recording() -> None:
    bright, dark = (np.full((5, 5, 3), value) for value in (0.30, 0.20))

    def flicker(luminance: float | None) -> float:
        p = NightGradeParams(luminance=luminance)
        return float(np.abs(graded(no_sky(bright), p) / graded(no_sky(dark), p) - 1).max())

    assert flicker(None) < 1e-4
    assert flicker(0.22) > 0.4


# ---- tone


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("convention", ["physical", "paper"])
def test_tone_is_strictly_monotone(strength: float, convention: str) -> None:
    out = graded(ramp(), NightGradeParams(strength=strength, convention=convention)).reshape(-1, 3)
    assert (np.diff(out, axis=0) > 0).all()


def test_a_black_frame_stays_black_and_a_white_one_in_range() -> None:
    assert not graded(no_sky(np.zeros((3, 3, 3))), NIGHT).any()
    white = graded(no_sky(np.ones((3, 3, 3))), NIGHT)
    assert (white > 0).all()
    assert (white <= 1).all()


def test_night_is_blue_and_darker() -> None:
    rgb = np.full((2, 2, 3), 0.2)
    by_strength = [graded(no_sky(rgb), NightGradeParams(strength=s, luminance=0.22))[0, 0] for s in (0, 0.5, 1)]
    for out in by_strength:
        assert out[0] < out[1] < out[2] < 0.2
    assert (np.diff(np.array(by_strength) @ LUMINANCE) < 0).all()


def test_lamps_stay_brighter_than_paper_but_in_print() -> None:
    rgb = np.array([[[1.4] * 3, [20.0] * 3]])
    street = NightGradeParams(luminance=0.22)
    physical = graded(no_sky(rgb), street)[0]
    assert (physical[1] > 1.2 * physical[0]).all()
    printed = graded(no_sky(rgb * 2), replace(street, convention="paper"))[0]
    assert np.array_equal(printed[0], printed[1])


@pytest.mark.parametrize("strength", [0.0, 0.4, 1.0])
def test_the_printed_table_is_met_at_its_entries(strength: float) -> None:
    i = np.arange(256)[:, None]
    beta = 0.7 + 0.2 * (1 - strength)
    channels = np.array([0.85 - 0.15 * strength, 0.9 - 0.1 * strength, 1.05 + 0.2 * strength])
    table = np.clip(beta * i * channels, 0, 255)
    compressed = srgb_to_linear(i / 255)
    lit = compressed / (1 - 0.25 * compressed) / gain(0.22, strength)  # what the first two steps make code i of
    source = no_sky(np.repeat(lit[None], 3, axis=2))
    out = graded(source, NightGradeParams(strength=strength, luminance=0.22, convention="paper"))[0]
    assert np.allclose(255 * linear_to_srgb(out), table, atol=1e-3)
    assert np.allclose(factors(strength), beta * channels)


# ---- sky


def test_the_weight_is_the_mask_dilated_and_blurred() -> None:
    sky = frame(97, 83)["sky"]
    sky[60, 50] = True
    expected = ndimage.maximum_filter(sky.astype(float), size=13, mode="nearest")
    expected = ndimage.gaussian_filter(expected, sigma=3, truncate=3, mode="nearest")
    weight = sky_weight(sky, dilate_px=6, blur_px=3, rows=704)
    assert np.allclose(weight, expected, atol=1e-12)


@pytest.mark.parametrize("name", SETTINGS)
def test_the_weight_is_within_0_and_1_and_covers_the_sky(name: str) -> None:
    source = frame(160, 120)
    weight = reference("night_grade", source, SETTINGS[name])["sky_weight"]
    assert (weight >= 0).all()
    assert (weight <= 1 + 1e-12).all()
    assert (weight[source["sky"]] > 0.9).all()  # dilated by two standard deviations


def test_the_edge_fades_over_a_level_horizon() -> None:
    sky = np.arange(704)[:, None] < np.full(3, 300)
    profile = sky_weight(sky, dilate_px=20, blur_px=10, rows=704)[:, 1]
    assert np.allclose(profile[:290], 1)
    assert profile[319:321].mean() == pytest.approx(0.5)
    assert (np.diff(profile) <= 1e-12).all()
    assert not profile[350:].any()


def test_the_look_does_not_depend_on_the_resolution() -> None:
    def profile(rows: int, convention: str) -> np.ndarray:
        sky = np.arange(rows)[:, None] < np.full(2, rows // 2)
        source = frame(2, rows, sky=sky)
        weight = reference("night_grade", source, NightGradeParams(convention=convention))["sky_weight"][:, 0]
        return np.interp((np.arange(200) + 0.5) / 200, (np.arange(rows) + 0.5) / rows, weight)

    assert np.abs(profile(352, "physical") - profile(704, "physical")).max() < 0.02
    assert np.abs(profile(352, "paper") - profile(704, "paper")).max() > 0.5
    assert np.array_equal(profile(704, "paper"), profile(704, "physical"))


def test_the_sky_keeps_its_factor() -> None:
    sky = np.ones((30, 40), dtype=bool)
    source = frame(40, 30, sky=sky)
    assert np.allclose(graded(source, NIGHT), 0.6 * graded(source, NightGradeParams(sky_factor=1)), rtol=1e-12)


def test_without_sky_the_factor_has_no_effect() -> None:
    source = no_sky(frame()["rgb"])
    assert np.array_equal(graded(source, NIGHT), graded(source, NightGradeParams(sky_factor=1)))


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str) -> None:
    source, p = frame(150, 110), SETTINGS[name]
    # Under a black sky 1 - w cancels: the last bit of w weighs as much as all that is left.
    last_bit = 2.0**-24 * graded(source, replace(p, sky_factor=1)) if p.sky_factor == 0 else None
    check(opencl_backend, "night_grade", source, p, inherent=last_bit)


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check(opencl_backend, "night_grade", frame(*size, seed=sum(size)), NightGradeParams(convention="paper"))


@settings(max_examples=40, deadline=None)
@given(
    width=st.integers(1, 40),
    height=st.integers(1, 9),
    percentile=st.integers(1, 100),
    seed=st.integers(0, 2**31),
    ties=st.booleans(),
)
def test_any_percentile_is_exact(
    opencl_device: OpenCLBackend, width: int, height: int, percentile: int, seed: int, ties: bool
) -> None:
    # All luminances within the gain's slope and far apart: a neighbour's rank would show.
    rng = np.random.default_rng(seed)
    grey = 0.14 + 0.22 * rng.permutation(width * height) / (width * height)
    if ties:
        grey = np.round(grey, 2)
    rgb = np.repeat(grey.reshape(height, width, 1), 3, axis=2)
    check(opencl_device, "night_grade", no_sky(rgb), NightGradeParams(percentile=percentile))


HARD = {
    "black": np.zeros((54, 96, 3)),
    "white": np.ones((54, 96, 3)),
    "one value, all pixels": np.full((54, 96, 3), 0.2345),
    "all lamps": np.full((54, 96, 3), 1e5),
    "denormal": np.full((54, 96, 3), 1e-40),
    "nearly black": np.full((54, 96, 3), 1e-8),
    "two values": np.where(np.arange(96)[None, :, None] % 2, 0.15, np.full((54, 96, 3), 0.35)),
    "neighbouring floats": np.float32(0.25) * (1 + np.arange(54 * 96 * 3).reshape(54, 96, 3) * 2.0**-22),
    "every magnitude": 10.0 ** np.linspace(-20, 5, 54 * 96 * 3).reshape(54, 96, 3),
}


@pytest.mark.parametrize("convention", ["physical", "paper"])
@pytest.mark.parametrize("name", HARD)
def test_hard_pictures(opencl_device: OpenCLBackend, name: str, convention: str) -> None:
    source = frame(rgb=HARD[name].astype(np.float32))
    check(opencl_device, "night_grade", source, NightGradeParams(convention=convention))


@pytest.mark.parametrize("sky", [True, False], ids=["all sky", "no sky"])
def test_masks_full_and_empty(opencl_device: OpenCLBackend, sky: bool) -> None:
    check(opencl_device, "night_grade", frame(sky=np.full((54, 96), sky)), NIGHT)


@pytest.mark.parametrize("corner", [(0, 0), (0, -1), (-1, 0), (-1, -1)])
def test_a_mask_at_the_border(opencl_device: OpenCLBackend, corner: tuple[int, int]) -> None:
    sky = np.zeros((90, 100), dtype=bool)
    sky[corner] = True
    check(opencl_device, "night_grade", frame(100, 90, sky=sky), NightGradeParams(convention="paper"))


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_the_kernels_tone_is_strictly_monotone(opencl_device: OpenCLBackend, strength: float) -> None:
    out = on(opencl_device, "night_grade", ramp(), NightGradeParams(strength=strength))["rgb"].reshape(-1, 3)
    assert (np.diff(out, axis=0) > 0).all()


def test_a_static_scene_is_bit_equal(opencl_backend: OpenCLBackend) -> None:
    first = on(opencl_backend, "night_grade", frame(), NIGHT)
    on(opencl_backend, "night_grade", frame(40, 30, seed=9), NightGradeParams(percentile=20, luminance=0.1))
    on(opencl_backend, "night_grade", frame(seed=5), NightGradeParams(percentile=3))
    again = on(opencl_backend, "night_grade", frame(), NIGHT)
    for name in first:
        assert np.array_equal(first[name], again[name]), name


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"strength": 1.1}, "strength"),
        ({"percentile": 0}, "percentile"),
        ({"percentile": 101}, "percentile"),
        ({"luminance": -1.0}, "luminance"),
        ({"luminance": float("nan")}, "luminance"),
        ({"sky_factor": 1.5}, "sky_factor"),
        ({"sky_dilate_px": -1}, "sky_dilate_px"),
        ({"sky_blur_px": 33}, "sky_blur_px"),
        ({"convention": "literal"}, "convention"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        NightGradeParams(**wrong)
