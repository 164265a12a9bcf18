"""Environment maps as files: Radiance and OpenEXR, whole and damaged."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d.errors import InputError
from aw4d.io.hdr import read_radiance
from aw4d.io.images import exr_channels, write_exr


def gradient(width: int = 64) -> NDArray[np.float32]:
    """A map over six decades."""
    height = width // 2
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    ramp = 10.0 ** (row / height * 6 - 3)
    return np.stack([ramp, ramp * (1 + column / width), ramp * 0.3], axis=-1).astype(np.float32)


@pytest.fixture
def radiance(tmp_path: Path) -> Path:
    """A Radiance file written by another library."""
    path = tmp_path / "sky.hdr"
    assert cv2.imwrite(str(path), gradient()[..., ::-1])
    return path


def test_a_radiance_file_reads_as_another_library_wrote_it(radiance: Path) -> None:
    image = gradient()
    read = read_radiance(radiance)
    # One exponent for three channels: half a step of 1/256 of the largest one.
    assert (np.abs(read - image) <= image.max(axis=-1, keepdims=True) / 128).all()


def test_recorded_maps_read_as_another_library_reads_them(test_data: Path) -> None:
    for path in sorted((test_data / "hdri_cc0").glob("*.hdr")):
        other = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert other is not None
        np.testing.assert_allclose(read_radiance(path), other[..., ::-1], rtol=2e-2, atol=1e-6)


def test_an_exr_map_is_exact(tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", exr_channels(gradient()))
    np.testing.assert_array_equal(read_radiance(tmp_path / "sky.exr"), gradient().astype(np.float64))


@pytest.mark.parametrize("keep", [0, 5, 40, 200, 1000])
def test_a_truncated_file_is_refused(radiance: Path, keep: int) -> None:
    radiance.write_bytes(radiance.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"sky\.hdr"):
        read_radiance(radiance)


@pytest.mark.parametrize("size", [b"-Y 1000000 +X 64\n", b"-Y 999999999999 +X 32000\n", b"-Y 99999999 +X 99999999\n"])
def test_a_size_that_the_file_cannot_hold(radiance: Path, size: bytes) -> None:
    radiance.write_bytes(radiance.read_bytes().replace(b"-Y 32 +X 64\n", size))
    with pytest.raises(InputError, match=r"sky\.hdr"):
        read_radiance(radiance)


def test_an_evenly_coloured_map_is_read(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "a.hdr"), np.full((500, 1000, 3), 0.5, np.float32))  # in the longest runs
    assert read_radiance(tmp_path / "a.hdr").shape == (500, 1000, 3)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.hdr or \.exr"):
        read_radiance(tmp_path / "sky.png")
    with pytest.raises(InputError, match="none"):
        read_radiance(tmp_path / "none.hdr")
    square = tmp_path / "square.exr"
    write_exr(square, exr_channels(gradient()[:, :32]))
    with pytest.raises(InputError, match="twice as wide"):
        read_radiance(square)
    black = tmp_path / "black.exr"
    write_exr(black, exr_channels(np.zeros((4, 8, 3), np.float32)))
    with pytest.raises(InputError, match="light"):
        read_radiance(black)
