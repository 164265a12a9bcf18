"""A recorded or procedural sequence: a Zarr v3 folder with a chunk a frame, read lazily and written atomically."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import logging
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import IO, Any

import cv2
import numpy as np
import zarr
import zarr.codecs
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.colour import decode_srgb8, encode_srgb8, look_up
from aw4d.errors import InputError
from aw4d.exchange import put
from aw4d.gbuffer import PLANES, GBuffer, Plane

log = logging.getLogger("aw4d")
FORMAT = "aw4d-clip"
VERSION = 1
SUFFIX_PARTIAL = ".partial"
_ROWS = 32  # of normals that are decoded together


@dataclass(frozen=True, kw_only=True)
class Stored:
    """How a plane lies in the file: dtype, the maps into and out of it, and whether every code is an admitted value."""

    dtype: str
    encode: Callable[[Plane], Plane]
    decode: Callable[[Plane], Plane]
    sound: bool = False


def _float(dtype: str) -> Stored:
    # Clipping before float16: albedo 1.0 must not come back as 1.0005, nor 1e5 as inf.
    limit = float(np.finfo(dtype).max)
    decode = _from_float16 if dtype == "float16" else lambda v: v.astype(np.float32)
    return Stored(dtype=dtype, encode=lambda v: np.clip(v, -limit, limit).astype(dtype), decode=decode)


_OF_FLOAT16 = np.arange(2**16, dtype=np.uint16).view(np.float16).astype(np.float32)


def _from_float16(v: Plane) -> Plane:
    return look_up(_OF_FLOAT16, v.view(np.uint16))


def _unit_vectors(v: Plane) -> Plane:
    """Vectors (H, W, 3) at length 1; a few rows at a time, channel by channel: both stay in the cache."""
    out = np.empty(v.shape, dtype=np.float32)
    for first in range(0, len(v), _ROWS):
        rows = slice(first, first + _ROWS)
        x, y, z = (channel.astype(np.float32) for channel in cv2.split(v[rows]))
        length = np.sqrt(x * x + y * y + z * z)
        cv2.merge([x / length, y / length, z / length], out[rows])
    return out


def _snorm16() -> Stored:
    return Stored(dtype="int16", encode=lambda v: np.rint(v * 32767).astype(np.int16), decode=_unit_vectors)


def _unorm8() -> Stored:
    return Stored(
        dtype="uint8",
        encode=lambda v: np.rint(v * 255).astype(np.uint8),
        decode=lambda v: v.astype(np.float32) / np.float32(255),
        sound=True,
    )


# Recordings have 8 bits a channel; depth keeps full float32 (quantised depth is the paper's aliasing ablation).
STORED: dict[str, Stored] = {
    "rgb": Stored(dtype="uint8", encode=encode_srgb8, decode=decode_srgb8, sound=True),
    "depth": _float("float32"),
    "normal": _snorm16(),
    "albedo": _float("float16"),
    "roughness": _unorm8(),
    "metallic": _unorm8(),
    "emissive": _float("float16"),
    "sky": Stored(dtype="bool", encode=lambda v: v, decode=lambda v: v, sound=True),
    "road": Stored(dtype="bool", encode=lambda v: v, decode=lambda v: v, sound=True),
    "vehicle": Stored(dtype="uint16", encode=lambda v: v.astype(np.uint16), decode=lambda v: v.astype(np.int32)),
    "street_light": Stored(dtype="uint16", encode=lambda v: v.astype(np.uint16), decode=lambda v: v.astype(np.int32)),
}


@dataclass(frozen=True, kw_only=True)
class ClipInfo:
    """Everything about a clip that is not a plane.

    Parameters
    ----------
    name
        Name of the recording.
    width, height
        Frame size [px].
    K
        Intrinsic matrices, (N, 3, 3) [px].
    camera_to_world
        Poses, (N, 4, 4), about `world_origin`.
    times
        Seconds since the first frame, (N,), increasing.
    world_origin
        What was subtracted from the recording's own coordinates [m] before anything became float32.
    provenance
        Where each plane comes from, by plane or topic.
    approximations
        Plain sentences on what is not measured.
    licence
        The recording's licence, as its owner states it.
    environment
        Mean linear radiance of "sky" and of "ground" (all that is not sky) over the clip, RGB.
    sky_depth_m
        Depth given to the sky [m].
    boxes
        3D boxes of each frame.
    """

    name: str
    width: int
    height: int
    K: NDArray[np.float64]
    camera_to_world: NDArray[np.float64]
    times: NDArray[np.float64]
    world_origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    provenance: dict[str, str] = field(default_factory=dict)
    approximations: list[str] = field(default_factory=list)
    licence: str = ""
    environment: dict[str, list[float]] = field(default_factory=dict)
    sky_depth_m: float | None = None
    boxes: list[list[Box]] = field(default_factory=list)

    def __post_init__(self) -> None:
        n = len(self.times)
        if n == 0:
            raise InputError(f"{self.name}: expected at least one frame, got none")
        if self.K.shape != (n, 3, 3) or self.camera_to_world.shape != (n, 4, 4):
            raise InputError(
                f"{self.name}: expected K ({n}, 3, 3) and poses ({n}, 4, 4), "
                f"got {self.K.shape} and {self.camera_to_world.shape}"
            )
        if n > 1 and not (np.diff(self.times) > 0).all():
            raise InputError(f"{self.name}: expected increasing times, got {self.times[:8].tolist()} …")

    def __len__(self) -> int:
        return len(self.times)

    @property
    def fps(self) -> float:
        """Frames a second, from the median step; 10 for a single frame."""
        return 10.0 if len(self) < 2 else float(1 / np.median(np.diff(self.times)))

    def camera(self, index: int) -> Camera:
        """Camera of a frame, the same object every time: it is checked once, and asked for by all who draw a frame."""
        if index not in self._cameras:
            self._cameras[index] = Camera(
                width=self.width, height=self.height, K=self.K[index], camera_to_world=self.camera_to_world[index]
            )
        return self._cameras[index]

    @cached_property
    def _cameras(self) -> dict[int, Camera]:
        return {}

    def to_json(self) -> dict[str, Any]:
        """Attributes as plain JSON."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "width": self.width,
            "height": self.height,
            "K": self.K.tolist(),
            "camera_to_world": self.camera_to_world.tolist(),
            "times": self.times.tolist(),
            "world_origin": list(self.world_origin),
            "units": {name: spec.unit for name, spec in PLANES.items()},
            "provenance": self.provenance,
            "approximations": self.approximations,
            "licence": self.licence,
            "environment": self.environment,
            "sky_depth_m": self.sky_depth_m,
            "boxes": [[box.to_json() for box in frame] for frame in self.boxes],
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ClipInfo:
        """Read back what `to_json` wrote."""
        x, y, z = data["world_origin"]
        return cls(
            name=data["name"],
            width=data["width"],
            height=data["height"],
            K=np.asarray(data["K"], dtype=np.float64),
            camera_to_world=np.asarray(data["camera_to_world"], dtype=np.float64),
            times=np.asarray(data["times"], dtype=np.float64),
            world_origin=(x, y, z),
            provenance=data["provenance"],
            approximations=data["approximations"],
            licence=data["licence"],
            environment=data["environment"],
            sky_depth_m=data["sky_depth_m"],
            boxes=[[Box.from_json(box) for box in frame] for frame in data["boxes"]],
        )


class Clip:
    """A clip on disk, opened for reading; frames are read when asked for, plane by plane.

    Parameters
    ----------
    path
        A folder that `ClipWriter` finished.

    Raises
    ------
    InputError
        The path is no clip, or was written by a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.exists():
            raise InputError(f"{self.path}: no such clip")
        try:
            self._group = zarr.open_group(self.path, mode="r")
            data: Any = dict(self._group.attrs)
            if data.get("format") != FORMAT:
                raise KeyError("format")
            if data["version"] != VERSION:
                raise InputError(f"{self.path}: expected clip version {VERSION}, got {data['version']}")
            self.info = ClipInfo.from_json(data)
            self.planes: tuple[str, ...] = tuple(name for name in PLANES if name in self._group)
            self._arrays: dict[str, Any] = {name: self._group[name] for name in self.planes}
        except InputError:
            raise
        except Exception as error:  # zarr raises many kinds for "this is no group of mine"
            hint = " (an unfinished ingest)" if self.path.name.endswith(SUFFIX_PARTIAL) else ""
            raise InputError(f"{self.path}: expected a clip made by `aw4d ingest`, got something else{hint}") from error

    def __len__(self) -> int:
        return len(self.info)

    def _chunk(self, name: str, index: int) -> Plane:
        array = self._arrays[name]
        place = f"{name}/c/{index}" + "/0" * (array.ndim - 1)
        return self._read(f"frame {index}, {name}", place, lambda: array[index])

    def _read(self, what: str, place: str, read: Callable[[], Any]) -> Plane:
        # Zarr answers a chunk that is not there with its fill value: a lost frame would read as black.
        if not (self.path / place).is_file():
            raise InputError(f"{self.path}: {what}: expected the chunk {place}, got no file")
        try:
            return np.asarray(read())
        except Exception as error:  # a truncated or altered chunk fails in whichever codec meets it first
            raise InputError(f"{self.path}: {what}: chunk cannot be read ({error})") from error

    def frame(self, index: int, planes: Sequence[str] | None = None) -> GBuffer:
        """Read one frame.

        Parameters
        ----------
        index
            0 to len - 1.
        planes
            Names of the planes to read; all by default.

        Raises
        ------
        InputError
            There is no such frame or plane, or a chunk is lost or damaged.
        """
        if not 0 <= index < len(self):
            raise InputError(f"{self.path}: expected a frame in 0:{len(self)}, got {index}")
        wanted = self.planes if planes is None else planes
        missing = [name for name in wanted if name not in self._arrays]
        if missing:
            raise InputError(f"{self.path}: has no plane {', '.join(missing)} (it has: {', '.join(self.planes)})")
        values = {name: STORED[name].decode(self._chunk(name, index)) for name in wanted}
        sound = frozenset(name for name in wanted if STORED[name].sound)
        return GBuffer(values, camera=self.info.camera(index), time=float(self.info.times[index]), sound=sound)

    def stamp(self, names: Sequence[str]) -> str:
        """Names the content of planes, and of "points", by the size and time of change of every file.

        For keys of what follows from them.
        """
        places = [Path("zarr.json")]
        for name in names:
            end = ("0",) * (self._arrays[name].ndim - 1) if name in self._arrays else ()
            places += [
                Path(name, f"{index:06d}", "c", "0", "0") if name == "points" else Path(name, "c", str(index), *end)
                for index in range(len(self))
            ]
        digest = hashlib.sha256(str(self.path.resolve()).encode())
        for place in places:
            with contextlib.suppress(OSError):  # what is not there belongs to the content, too
                found = (self.path / place).stat()
                digest.update(repr((str(place), found.st_size, found.st_mtime_ns)).encode())
        return digest.hexdigest()

    def boxes(self, index: int) -> list[Box]:
        """3D boxes of a frame; empty where the recording has none."""
        return self.info.boxes[index] if self.info.boxes else []

    def points(self, index: int) -> NDArray[np.float32] | None:
        """LiDAR returns of a frame, camera frame [m] and reflectance, (n, 4); None where there are none."""
        name = f"points/{index:06d}"
        try:
            if name not in self._group:
                return None
            array: Any = self._group[name]
        except Exception as error:  # zarr's own file about the array is damaged
            raise InputError(f"{self.path}: frame {index}, points: cannot be read ({error})") from error
        if not array.shape[0]:
            return np.empty((0, 4), dtype=np.float32)
        return self._read(f"frame {index}, points", f"{name}/c/0/0", lambda: array[:])


_WRITE_ALL: Any = {"write_empty_chunks": True}


def _codecs() -> tuple[Any, ...]:
    # The checksum turns a flipped bit into an error instead of a wrong picture.
    return (
        zarr.codecs.BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"),
        zarr.codecs.Crc32cCodec(),
    )


class ClipWriter:
    """Writes a clip so that a killed run leaves nothing that opens as one, and the next run resumes it.

    Frames go to `<path>.partial`, each with a marker once all of it is written; `finish` adds the attributes and
    renames the folder into place. A partial folder of another source, other settings or another size is started again.

    Parameters
    ----------
    path
        The clip to write. Must not exist, unless `overwrite`.
    shape
        (frames, height, width).
    fingerprint
        Names source and settings; a partial folder is resumed only under the same fingerprint.
    overwrite
        Replace an existing clip (and nothing else) when this one is whole.

    Raises
    ------
    InputError
        The target exists or cannot be written, or another process is writing it.
    """

    def __init__(self, path: str | Path, shape: tuple[int, int, int], *, fingerprint: str, overwrite: bool = False):
        self.path = Path(path)
        self.shape = shape
        self.overwrite = overwrite
        self._partial = self.path.with_name(self.path.name + SUFFIX_PARTIAL)
        self._check_target()
        self._lock: IO[str] | None = None
        try:
            self._partial.mkdir(parents=True, exist_ok=True)
            self._take_lock()
            self._resume_or_restart({"fingerprint": fingerprint, "shape": list(shape)})
            self._group = zarr.open_group(self._partial / "clip", mode="a")
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error})") from error

    def _check_target(self) -> None:
        if not self.path.exists():
            return
        if not self.overwrite:
            raise InputError(f"{self.path}: exists already; give another path or --overwrite")
        Clip(self.path)  # refuses to replace anything that is not a clip

    def _take_lock(self) -> None:
        self._lock = (self._partial / "lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._lock.close()
            raise InputError(f"{self.path}: another process is writing this clip") from None

    def _resume_or_restart(self, plan: dict[str, Any]) -> None:
        note = self._partial / "plan.json"
        with contextlib.suppress(OSError, ValueError, RecursionError):
            if json.loads(note.read_text()) == plan:
                self._remove_litter()
                return
        if note.exists():
            log.warning("%s: holds frames of another source or other settings; starting again", self._partial)
        note.unlink(missing_ok=True)  # first: killed from here on, the next run must not take what is left for whole
        for child in self._partial.iterdir():
            if child.is_dir():
                shutil.rmtree(child)
        (self._partial / "done").mkdir()
        note.write_text(json.dumps(plan))

    def _remove_litter(self) -> None:
        for left in (self._partial / "clip").rglob("*.partial"):  # Zarr's own half-written chunks
            left.unlink()

    @property
    def done(self) -> frozenset[int]:
        """Frames that are whole on disk, from this run or the one that it resumes."""
        return frozenset(int(marker.name) for marker in (self._partial / "done").iterdir())

    def _array(self, name: str) -> Any:
        if name in self._group:
            # Zarr does not store this setting, and without it leaves out a plane of zeros as if it were lost.
            held: Any = self._group[name]
            return held.with_config(_WRITE_ALL)
        shape = (self.shape[0], *PLANES[name].shape(*self.shape[1:]))
        return self._group.create_array(
            name,
            shape=shape,
            chunks=(1, *shape[1:]),
            dtype=STORED[name].dtype,
            compressors=_codecs(),
            fill_value=0,
            config=_WRITE_ALL,
        )

    def write(self, index: int, frame: GBuffer, points: NDArray[np.float32] | None = None) -> None:
        """Write one frame whole, with its LiDAR returns (n, 4) if there are any."""
        if frame.camera.shape != self.shape[1:]:
            raise InputError(f"frame {index}: expected size {self.shape[1:]}, got {frame.camera.shape}")
        try:
            for name in frame:
                self._array(name)[index] = STORED[name].encode(frame[name])
            if points is not None:
                self._write_points(index, points)
            (self._partial / "done" / f"{index:06d}").touch()
        except OSError as error:
            raise InputError(f"{self.path}: frame {index} cannot be written ({error.strerror or error})") from error

    def _write_points(self, index: int, points: NDArray[np.float32]) -> None:
        array = self._group.create_array(
            f"points/{index:06d}",
            shape=points.shape,
            chunks=(max(1, len(points)), 4),
            dtype="float32",
            compressors=_codecs(),
            overwrite=True,
            config=_WRITE_ALL,
        )
        array[:] = np.ascontiguousarray(points, dtype=np.float32)

    def read_back(self, name: str, index: int) -> Plane:
        """Plane of a frame that was written, for a second pass over the clip."""
        return STORED[name].decode(np.asarray(self._array(name)[index]))

    def rewrite(self, name: str, index: int, values: Plane) -> None:
        """Replace one plane of a frame that was written."""
        try:
            self._array(name)[index] = STORED[name].encode(values)
        except OSError as error:
            raise InputError(f"{self.path}: frame {index} cannot be written ({error.strerror or error})") from error

    def finish(self, info: ClipInfo) -> Clip:
        """Check that every frame is there, write the attributes, and put the clip in its place.

        Raises
        ------
        InputError
            A frame is missing, or the folder cannot be renamed.
        """
        missing = sorted(set(range(self.shape[0])) - self.done)
        if missing:
            raise InputError(f"{self.path}: frames {missing[:8]} were never written")
        try:
            self._group.attrs.update(info.to_json())
            self._replace()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error})") from error
        finally:
            self.close()
        return Clip(self.path)

    def _replace(self) -> None:
        (self._partial / "plan.json").unlink()  # killed behind the next line, no run must resume what was replaced
        put(self._partial / "clip", self.path)
        shutil.rmtree(self._partial)

    def discard(self) -> None:
        """Give up: remove what was written, so that nothing is left behind."""
        shutil.rmtree(self._partial, ignore_errors=True)
        self.close()

    def close(self) -> None:
        """Let go of the lock; what was written stays for a later run to resume."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def __enter__(self) -> ClipWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def indices(text: str | None, count: int) -> range:
    """Frames named by `A:B` (either end open, as in Python) or by one number, or all of them.

    Raises
    ------
    InputError
        The text is not of that form or names no frame of the clip.
    """
    if text is None:
        return range(count)
    first, colon, last = text.partition(":")
    try:
        start, stop = int(first) if first else None, int(last) if last else None
        chosen = range(count)[start:stop] if colon else range(count)[int(first) : int(first) + 1]
    except ValueError:
        raise InputError(f"--frames: expected A:B or one number, got {text!r}") from None
    if not chosen:
        raise InputError(f"--frames: {text} names no frame of 0:{count}")
    return chosen


def iterate(clip: Clip, frames: Sequence[int], planes: Sequence[str] | None = None) -> Iterator[GBuffer]:
    """Frames of a clip in the order asked for."""
    for index in frames:
        yield clip.frame(index, planes)
