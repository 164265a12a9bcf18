"""PNG, JPEG and OpenEXR images: read whole or not at all, written atomically."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from aw4d.errors import InputError
from aw4d.io.files import read_bytes, replacing

PNG = (".png",)
JPEG = (".jpg", ".jpeg")
PICTURES = PNG + JPEG

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_START_OF_SCAN, _END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"
_JPEG_FRAMES = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # markers; the others are tables and an extension
_JPEG_BLOCK = 32 * 32  # [px] that are coded together at most, and take a bit at least


def _check_png(path: Path, data: bytes) -> None:
    """Walk the chunks: the decoder fills what is lost from a damaged PNG with grey and says nothing."""
    if not data.startswith(_PNG_SIGNATURE):
        raise InputError(f"{path}: expected a PNG image, got another kind of file")
    at, kind = len(_PNG_SIGNATURE), b""
    while kind != b"IEND":
        length = int.from_bytes(data[at : at + 4], "big")
        end = at + 12 + length
        if end > len(data):
            raise InputError(f"{path}: truncated PNG: ends after {len(data)} bytes, inside or before a chunk")
        kind = data[at + 4 : at + 8]
        if zlib.crc32(memoryview(data)[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise InputError(f"{path}: damaged PNG: chunk {kind!r} at byte {at} does not match its checksum")
        at = end


def _check_jpeg(path: Path, data: bytes) -> None:
    # A marker cannot occur inside entropy-coded data, so a scan without an end marker after it was cut off.
    if not data.startswith(b"\xff\xd8") or data.rfind(_END_OF_IMAGE) < data.rfind(_START_OF_SCAN):
        raise InputError(f"{path}: expected a whole JPEG image, got one that is truncated or another kind of file")
    height, width = _jpeg_size(path, data)
    if height * width > 8 * _JPEG_BLOCK * len(data):  # the decoder fills with grey whatever a false size asks for
        raise InputError(f"{path}: expected {width} x {height} pixels, got a JPEG image of {len(data)} bytes")


def _jpeg_size(path: Path, data: bytes) -> tuple[int, int]:
    """Height and width [px] by the frame header, which lies before the scans. ITU-T T.81, annex B."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _JPEG_FRAMES:
            return int.from_bytes(data[at + 5 : at + 7], "big"), int.from_bytes(data[at + 7 : at + 9], "big")
        at += 1 if marker == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise InputError(f"{path}: damaged JPEG: no header of a frame")


def _decode(path: Path, flags: int) -> NDArray[Any]:
    data = read_bytes(path)
    if path.suffix.lower() in PNG:
        _check_png(path, data)
    elif path.suffix.lower() in JPEG:
        _check_jpeg(path, data)
    else:
        raise InputError(f"{path}: expected a PNG or JPEG image")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:  # a size beyond what OpenCV takes, or than there is memory for
        raise InputError(f"{path}: cannot be decoded ({error.err})") from error
    if image is None:
        raise InputError(f"{path}: cannot be decoded")
    return np.asarray(image)


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Read a PNG or JPEG picture as sRGB, (H, W, 3) uint8; grey is spread to three channels, alpha is dropped.

    Raises
    ------
    InputError
        The file cannot be read, is truncated or damaged, or is no such image.
    """
    return np.asarray(cv2.cvtColor(_decode(path, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB), dtype=np.uint8)


def read_png(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Read the codes of a PNG as they are: (H, W) or (H, W, 3) in RGB order, uint8 or uint16; alpha is dropped.

    Raises
    ------
    InputError
        The file cannot be read, is truncated or damaged, or is no PNG.
    """
    image = _decode(path, cv2.IMREAD_UNCHANGED)
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., 2::-1])


def write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write codes, (H, W) or (H, W, 3) in RGB order, uint8 or uint16, as a PNG.

    Raises
    ------
    InputError
        The array is not of that kind, or the file cannot be written.
    """
    grey = image.ndim == 2
    if image.dtype not in (np.uint8, np.uint16) or not (grey or (image.ndim == 3 and image.shape[2] == 3)):
        raise InputError(f"{path}: expected (H, W) or (H, W, 3) uint8 or uint16, got {image.shape} {image.dtype.name}")
    # Level 1: half the time of the default for 5 % more bytes.
    _, data = cv2.imencode(".png", image if grey else image[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1])
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def read_exr(path: Path) -> dict[str, NDArray[np.float32]]:
    """Read the channels of an OpenEXR image, name to (H, W) float32.

    Raises
    ------
    InputError
        The file cannot be read, is truncated, or is no OpenEXR image.
    """
    read_bytes(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: np.asarray(channel.pixels, dtype=np.float32) for name, channel in file.channels().items()}
    except Exception as error:  # the library raises bare RuntimeErrors
        raise InputError(f"{path}: expected a whole OpenEXR image ({error})") from error


def read_exr_plane(path: Path) -> NDArray[np.float32]:
    """Read an OpenEXR image as (H, W, 3) from R, G, B or X, Y, Z, or as (H, W) from its only channel.

    Raises
    ------
    InputError
        As `read_exr`, or the channels are others.
    """
    channels = read_exr(path)
    for names in (("R", "G", "B"), ("X", "Y", "Z")):
        if all(name in channels for name in names):
            return np.stack([channels[name] for name in names], axis=-1)
    if len(channels) != 1:
        raise InputError(f"{path}: expected channels R, G, B or one channel, got {', '.join(sorted(channels))}")
    return next(iter(channels.values()))


def write_exr(path: Path, channels: Mapping[str, NDArray[np.float32]]) -> None:
    """Write named channels, each (H, W) float32, as one OpenEXR image (ZIP compression, lossless).

    Raises
    ------
    InputError
        The file cannot be written.
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    pixels = {name: np.ascontiguousarray(plane, dtype=np.float32) for name, plane in channels.items()}
    with replacing(path) as temporary:
        try:
            OpenEXR.File(header, pixels).write(str(temporary))
        except RuntimeError as error:
            raise OSError(str(error)) from error


def exr_channels(plane: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Channels of a plane for `write_exr`: R, G, B of (H, W, 3), or Y of (H, W)."""
    return {"Y": plane} if plane.ndim == 2 else {name: plane[..., i] for i, name in enumerate("RGB")}
