"""The 8-bit picture: the nearest codes, nothing beyond black and white, and the kernel against the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from aw4d.backend import Backend
from aw4d.backend_numpy import NumpyBackend
from aw4d.colour import decode_srgb8, encode_srgb8, srgb_codes
from aw4d.lights.light import in_camera
from aw4d.passes import IMAGE
from aw4d.scene import Scene
from reference_numpy.srgb8 import srgb8
from tests.grade_inputs import SIZES, frame

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from aw4d.backend_opencl import OpenCLBackend

CODES = np.arange(256, dtype=np.uint8)
TIE = 1e-3  # codes: float32 may round either way so near to the middle between two


def shown(backend: Backend, rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
    rows, columns, _ = rgb.shape
    source = frame(columns, rows, rgb=rgb)
    planes = backend.upload(source, Scene(lights=in_camera([], source.camera)))
    found = backend.download(planes, [IMAGE])[IMAGE]
    assert (found.dtype, found.shape) == (np.uint8, rgb.shape)
    return np.asarray(found)


def test_a_recorded_picture_comes_back() -> None:
    picture = np.stack([CODES, CODES[::-1], CODES], axis=-1)[None]
    assert np.array_equal(srgb8(rgb=decode_srgb8(picture).astype(np.float64))[IMAGE], picture)


def test_more_than_white_is_white() -> None:
    beyond = srgb8(rgb=np.array([[[1.0, 1.001, 1e5], [0.0, 1e-9, 1e-4]]]))[IMAGE]
    assert beyond.tolist() == [[[255, 255, 255], [0, 0, 0]]]


def test_codes_are_the_nearest() -> None:
    rgb = np.random.default_rng(1).random((50, 70, 3)) ** 3
    assert np.abs(srgb8(rgb=rgb)[IMAGE] - srgb_codes(rgb)).max() <= 0.5


@pytest.mark.parametrize("size", SIZES)
def test_kernel_gives_the_codes_of_the_reference(opencl_backend: OpenCLBackend, size: tuple[int, int]) -> None:
    columns, rows = size
    rgb = 1.5 * np.random.default_rng(columns).random((rows, columns, 3), np.float32) ** 3
    assert np.abs(shown(opencl_backend, rgb) - srgb_codes(rgb)).max() <= 0.5 + TIE


def test_kernel_keeps_every_code_and_its_limits(opencl_backend: OpenCLBackend) -> None:
    picture = np.stack([CODES, CODES[::-1], np.roll(CODES, 9)], axis=-1)[None]
    assert np.array_equal(shown(opencl_backend, decode_srgb8(picture)), picture)
    limits = np.float32([[[0.0, 1e-45, 1e-30], [1.0, np.nextafter(np.float32(1), np.float32(2)), 1e5]]])
    assert shown(opencl_backend, limits).tolist() == [[[0, 0, 0], [255, 255, 255]]]


def test_backends_and_table_agree(opencl_device: OpenCLBackend) -> None:
    rgb = np.random.default_rng(3).random((40, 60, 3), np.float32)
    exact = shown(NumpyBackend(), rgb).astype(int)
    near_a_tie = np.abs(srgb_codes(rgb) % 1 - 0.5) < 0.026  # where the table may round either way
    for other in (shown(opencl_device, rgb), encode_srgb8(rgb)):
        assert np.array_equal(other[~near_a_tie], exact[~near_a_tie])
        assert np.abs(other - exact).max() <= 1
