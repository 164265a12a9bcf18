"""Fusion of ambient and local light: light adds up, and every kernel against the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.params import HarmonizeParams
from tests.grade_inputs import SIZES, check, frame, on, reference

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

SETTINGS = {
    "default": HarmonizeParams(),
    "replacing": HarmonizeParams(strength=3.0),
    "paper": HarmonizeParams(convention="paper"),
    "paper, strong": HarmonizeParams(convention="paper", strength=20.0),
}


def lamps(width: int = 96, height: int = 54, seed: int = 1) -> np.ndarray:
    """Light from 0 to 5, a third of it none; nowhere so near the threshold that rounding decides."""
    rng = np.random.default_rng(seed)
    drawn = 5 * np.maximum(rng.random((height, width, 3)) - 1 / 3, 0) ** 3
    at_threshold = np.abs(drawn.mean(axis=-1) - 0.05) < 1e-6
    return np.where(at_threshold[..., None], 0.0, drawn).astype(np.float32)


def one(ambient: float, lamp: float, p: HarmonizeParams) -> float:
    """The result of one grey pixel."""
    rgb, direct = (np.full((1, 1, 3), value, dtype=np.float64) for value in (ambient, lamp))
    return float(reference("harmonize", frame(1, 1), p, rgb=rgb, direct=direct)["rgb"][0, 0, 0])


def test_light_adds_up() -> None:
    source, direct = frame(), lamps()
    out = reference("harmonize", source, HarmonizeParams(), direct=direct)
    assert np.array_equal(out["rgb"], source["rgb"].astype(np.float64) + direct)
    assert not out["fusion_weight"].any()


@pytest.mark.parametrize("name", SETTINGS)
def test_without_lamps_nothing_changes(name: str) -> None:
    source = frame()
    dark = np.zeros_like(source["rgb"])
    assert np.array_equal(reference("harmonize", source, SETTINGS[name], direct=dark)["rgb"], source["rgb"])


def test_a_lamp_never_darkens() -> None:
    source, direct = frame(), lamps()
    assert (reference("harmonize", source, HarmonizeParams(), direct=direct)["rgb"] >= source["rgb"]).all()


@pytest.mark.parametrize(("ambient", "lamp", "printed"), [(0.1, 0.06, 0.0976), (0.5, 0.1, 0.46), (0.5, 0.4, 0.46)])
def test_the_printed_form_lets_a_lamp_darken(ambient: float, lamp: float, printed: float) -> None:
    assert one(ambient, lamp, HarmonizeParams(convention="paper")) == pytest.approx(printed)
    assert printed < ambient
    assert one(ambient, lamp, HarmonizeParams()) == pytest.approx(ambient + lamp)


def test_only_the_printed_form_jumps_at_the_threshold() -> None:
    below, above = 0.05 - 1e-9, 0.05 + 1e-9
    smooth = [one(0.8, lamp, HarmonizeParams(strength=5.0)) for lamp in (below, above)]
    printed = [one(0.8, lamp, HarmonizeParams(convention="paper", strength=5.0)) for lamp in (below, above)]
    assert abs(smooth[1] - smooth[0]) < 1e-7
    assert printed[0] - printed[1] == pytest.approx(0.25 * (0.8 - 0.05), rel=1e-6)


def test_the_printed_formula() -> None:
    source, direct = frame(5, 4), lamps(5, 4)
    out = reference("harmonize", source, HarmonizeParams(convention="paper", strength=2.0), direct=direct)
    mean = direct.astype(np.float64).mean(axis=-1)
    W = np.clip(2.0 * np.where(mean >= 0.05, mean, 0), 0, 1)[..., None]
    assert np.allclose(out["rgb"], (1 - W) * source["rgb"] + W * direct, rtol=1e-12)
    assert np.allclose(out["fusion_weight"], W[..., 0], rtol=1e-12)


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str) -> None:
    check(opencl_backend, "harmonize", frame(), SETTINGS[name], direct=lamps())


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check(opencl_backend, "harmonize", frame(*size), SETTINGS["replacing"], direct=lamps(*size))


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("radiance", [0.0, 1e-30, 1e5])
def test_radiance(opencl_device: OpenCLBackend, radiance: float, name: str) -> None:
    plane = np.full((54, 96, 3), radiance, dtype=np.float32)
    check(opencl_device, "harmonize", frame(), SETTINGS[name], direct=plane)
    # Where W nears 1 the last bit of it weighs as much as all that is left of the ambient light.
    last_bit = 2.0**-24 * plane.astype(np.float64)
    check(opencl_device, "harmonize", frame(rgb=plane), SETTINGS[name], direct=lamps(), inherent=last_bit)


def test_the_sum_is_exact(opencl_device: OpenCLBackend) -> None:
    source, direct = frame(), lamps()
    found = on(opencl_device, "harmonize", source, HarmonizeParams(), direct=direct)["rgb"]
    assert np.array_equal(found, source["rgb"] + direct)


# ---- parameters


def test_the_strength_follows_the_convention() -> None:
    assert HarmonizeParams().strength == 0
    assert HarmonizeParams(convention="paper").strength == 1
    assert HarmonizeParams(convention="paper", strength=0.3).strength == 0.3


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"strength": -0.1}, "strength"),
        ({"threshold": float("nan")}, "threshold"),
        ({"threshold": -1.0}, "threshold"),
        ({"convention": "literal"}, "convention"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        HarmonizeParams(**wrong)
