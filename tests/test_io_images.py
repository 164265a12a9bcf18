"""Pictures are read whole or refused, and written whole or not at all."""

from __future__ import annotations

import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from aw4d.errors import InputError
from aw4d.io.files import replacing
from aw4d.io.images import exr_channels, read_exr, read_exr_plane, read_png, read_rgb, write_exr, write_png

ODD_NAME = "Kreuzung Süd 東 1"


def picture(dtype: type = np.uint8, channels: int = 3) -> np.ndarray:
    shape = (23, 37, 3) if channels == 3 else (23, 37)
    return np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 3])
def test_png_round_trip(tmp_path: Path, dtype: type, channels: int) -> None:
    path = tmp_path / f"{ODD_NAME}.png"
    write_png(path, picture(dtype, channels))
    np.testing.assert_array_equal(read_png(path), picture(dtype, channels))
    assert list(tmp_path.iterdir()) == [path]


def test_png_is_rgb(tmp_path: Path) -> None:
    red = np.zeros((2, 2, 3), np.uint8)
    red[..., 0] = 255
    write_png(tmp_path / "red.png", red)
    assert cv2.imread(str(tmp_path / "red.png"))[0, 0].tolist() == [0, 0, 255]
    np.testing.assert_array_equal(read_rgb(tmp_path / "red.png"), red)


@pytest.mark.parametrize("kept", [0.0, 0.001, 0.1, 0.5, 0.9, 0.999])
def test_truncated_png(tmp_path: Path, kept: float) -> None:
    path = tmp_path / "a.png"
    write_png(path, picture())
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(InputError, match=r"a\.png"):
        read_rgb(path)


def test_every_flipped_byte_of_a_png_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    write_png(path, picture()[:5, :5])
    data = path.read_bytes()
    for place in range(len(data)):
        altered = bytearray(data)
        altered[place] ^= 0x10
        path.write_bytes(altered)
        with pytest.raises(InputError):
            read_rgb(path)


def test_png_with_a_false_size(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    write_png(path, picture())
    data = bytearray(path.read_bytes())
    data[20:24] = (500).to_bytes(4, "big")  # rows in the header; the checksum is made to fit
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a\.png"):
        read_rgb(path)


@pytest.mark.parametrize("side", [20_000, 65_000])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_size_that_the_file_cannot_hold(tmp_path: Path, suffix: str, side: int) -> None:
    path = tmp_path / f"a{suffix}"
    data = bytearray(cv2.imencode(suffix, picture())[1].tobytes())
    if suffix == ".png":
        data[16:24] = 2 * side.to_bytes(4, "big")
        data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    else:
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = 2 * side.to_bytes(2, "big")
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a\.(png|jpg)"):
        read_rgb(path)


@pytest.mark.parametrize("options", [[], [cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 2]])
@pytest.mark.parametrize("shape", [(1, 1, 3), (2000, 3000, 3), (23, 37)])
def test_the_smallest_jpegs_are_read(tmp_path: Path, shape: tuple[int, ...], options: list[int]) -> None:
    data = cv2.imencode(".jpg", np.full(shape, 128, np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 1, *options])[1]
    (tmp_path / "a.jpg").write_bytes(data.tobytes())
    assert read_rgb(tmp_path / "a.jpg").shape == (*shape[:2], 3)


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.6, 0.99])
def test_truncated_jpeg(tmp_path: Path, kept: float) -> None:
    path = tmp_path / "a.jpg"
    _, data = cv2.imencode(".jpg", picture())
    path.write_bytes(data.tobytes())
    assert read_rgb(path).shape == (23, 37, 3)
    path.write_bytes(data.tobytes()[: int(kept * data.size)])
    with pytest.raises(InputError, match=r"a\.jpg"):
        read_rgb(path)


def test_grey_and_alpha_become_rgb(tmp_path: Path) -> None:
    write_png(tmp_path / "grey.png", picture(channels=1))
    assert read_rgb(tmp_path / "grey.png").shape == (23, 37, 3)
    cv2.imwrite(str(tmp_path / "alpha.png"), np.zeros((4, 5, 4), np.uint8))
    assert read_rgb(tmp_path / "alpha.png").shape == read_png(tmp_path / "alpha.png").shape == (4, 5, 3)


def test_exr_round_trip(tmp_path: Path) -> None:
    path = tmp_path / f"{ODD_NAME}.exr"
    rng = np.random.default_rng(0)
    layers = {"R": rng.random((7, 13)), "depth.Z": rng.random((7, 13)) * 1e5, "G": np.zeros((7, 13))}
    written = {name: plane.astype(np.float32) for name, plane in layers.items()}
    write_exr(path, written)
    read = read_exr(path)
    assert set(read) == set(written)
    for name in written:
        np.testing.assert_array_equal(read[name], written[name])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("shape", [(7, 13), (7, 13, 3), (1, 1), (1, 1, 3)])
def test_exr_planes(tmp_path: Path, shape: tuple[int, ...]) -> None:
    plane = np.random.default_rng(0).random(shape).astype(np.float32)
    write_exr(tmp_path / "a.exr", exr_channels(plane))
    np.testing.assert_array_equal(read_exr_plane(tmp_path / "a.exr"), plane)


@pytest.mark.parametrize("kept", [0.0, 0.05, 0.5, 0.95])
def test_truncated_exr(tmp_path: Path, kept: float) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, exr_channels(np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)))
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(InputError, match=r"a\.exr"):
        read_exr(path)


def test_unwritable(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for path in (tmp_path / "file" / "a.png", tmp_path / "nowhere" / "a.png"):
        with pytest.raises(InputError, match="cannot be written"):
            write_png(path, picture())
    with pytest.raises(InputError, match="cannot be written"):
        write_exr(tmp_path / "nowhere" / "a.exr", exr_channels(np.zeros((2, 2), np.float32)))


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail() -> None:
        with replacing(path) as temporary:
            temporary.write_text("new, half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
