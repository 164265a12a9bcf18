"""The sky under clouds: brightness is kept, nothing else changes, and every kernel against the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.params import OvercastSkyParams
from reference_numpy.srgb import LUMINANCE
from tests.grade_inputs import SIZES, check, frame, on, reference

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

SETTINGS = {
    "default": OvercastSkyParams(),
    "paper": OvercastSkyParams(convention="paper"),
    "none": OvercastSkyParams(amount=0, desaturation=0),
    "all": OvercastSkyParams(amount=1, desaturation=1),
    "one channel": OvercastSkyParams(tint=(0, 0, 1e-3)),
}


def overcast(source: Any, p: OvercastSkyParams) -> np.ndarray:
    return reference("overcast_sky", source, p)["rgb"]


@pytest.mark.parametrize("name", [name for name in SETTINGS if name != "paper"])
def test_luminance_is_kept(name: str) -> None:
    source = frame()
    out = overcast(source, SETTINGS[name])
    assert np.allclose(out @ LUMINANCE, source["rgb"].astype(np.float64) @ LUMINANCE, rtol=1e-12)


def test_a_blue_sky_loses_most_of_its_colour() -> None:
    def purity(rgb: np.ndarray) -> float:
        return float(1 - rgb.min() / rgb.max())

    blue = np.broadcast_to(np.float32([0.2, 0.4, 0.9]), (1, 1, 3))
    out = overcast(frame(1, 1, rgb=blue, sky=np.ones((1, 1), dtype=bool)), OvercastSkyParams())
    assert purity(out) < 0.4 * purity(blue)
    assert (np.diff(out[0, 0]) > 0).all()  # what is left of it is bluish, as the tint


def test_only_sky_changes() -> None:
    source = frame()
    changed = (overcast(source, OvercastSkyParams()) != source["rgb"]).any(axis=-1)
    assert np.array_equal(changed, source["sky"])


def test_the_printed_form_knows_no_brightness() -> None:
    night = np.full((2, 2, 3), 0.01, dtype=np.float32)
    source = frame(2, 2, rgb=night, sky=np.ones((2, 2), dtype=bool))
    printed = overcast(source, OvercastSkyParams(convention="paper"))
    assert np.allclose(printed, 0.4 * night + 0.6 * np.array([0.55, 0.60, 0.70]), rtol=1e-6)
    assert np.allclose(overcast(source, OvercastSkyParams()) @ LUMINANCE, 0.01, rtol=1e-6)


def test_the_printed_formula() -> None:
    source = frame(5, 4, sky=np.ones((4, 5), dtype=bool))
    C = source["rgb"].astype(np.float64)
    Y = (C @ [0.2126, 0.7152, 0.0722])[..., None]
    expected = 0.4 * (0.3 * C + 0.7 * Y) + 0.6 * np.array([0.55, 0.60, 0.70])
    assert np.allclose(overcast(source, OvercastSkyParams(convention="paper")), expected, rtol=1e-12)


# ---- kernels against the reference


@pytest.mark.parametrize("name", SETTINGS)
def test_kernel_matches_reference(opencl_backend: OpenCLBackend, name: str) -> None:
    check(opencl_backend, "overcast_sky", frame(), SETTINGS[name])


@pytest.mark.parametrize("size", SIZES)
def test_every_size(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    check(opencl_backend, "overcast_sky", frame(*size), OvercastSkyParams())


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("radiance", [0.0, 1e-30, 1e5])
def test_radiance(opencl_device: OpenCLBackend, radiance: float, name: str) -> None:
    plane = np.full((54, 96, 3), radiance, dtype=np.float32)
    check(opencl_device, "overcast_sky", frame(rgb=plane), SETTINGS[name])


@pytest.mark.parametrize("sky", [True, False], ids=["all sky", "no sky"])
def test_masks_full_and_empty(opencl_device: OpenCLBackend, sky: bool) -> None:
    check(opencl_device, "overcast_sky", frame(sky=np.full((54, 96), sky)), OvercastSkyParams())


def test_other_pixels_keep_their_bits(opencl_backend: OpenCLBackend) -> None:
    source = frame(97, 55)
    found = on(opencl_backend, "overcast_sky", source, OvercastSkyParams())["rgb"]
    assert np.array_equal(found[~source["sky"]], source["rgb"][~source["sky"]])


# ---- parameters


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"tint": (0.0, 0.0, 0.0)}, "tint"),
        ({"tint": (0.5, -0.1, 0.5)}, "tint"),
        ({"amount": 1.5}, "amount"),
        ({"desaturation": float("inf")}, "desaturation"),
        ({"convention": "literal"}, "convention"),
    ],
)
def test_impossible_parameters_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        OvercastSkyParams(**wrong)
