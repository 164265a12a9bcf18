"""Video files: streamed in as pictures of a monocular recording, streamed out as H.264."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import av.error
import numpy as np
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from numpy.typing import NDArray

from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.io.files import fingerprint, replacing
from aw4d.io.horizon import Horizon, find_horizon, level_pose
from aw4d.io.source import Source

CRF = 18  # x264's constant quality; visually lossless
HORIZON_FRAMES = 9  # pictures that vote for the horizon
UNSPECIFIED = 2  # colour space code of a file that does not say


def _open(path: Path) -> Any:
    if not path.is_file():
        raise InputError(f"{path}: expected a video file, got {'a folder' if path.is_dir() else 'nothing'}")
    try:
        container = av.open(str(path), metadata_errors="replace")
    except (av.error.FFmpegError, OSError) as error:
        raise InputError(f"{path}: expected a whole video file ({error.strerror or error})") from error
    if not container.streams.video:
        container.close()
        raise InputError(f"{path}: expected a video stream, got none")
    return container


def _picture(frame: av.VideoFrame) -> NDArray[np.uint8]:
    # A file that does not name its matrix has BT.709 if it is of HD size, else BT.601, as players assume.
    matrix = None
    if frame.colorspace == UNSPECIFIED:
        matrix = Colorspace.ITU709 if frame.height >= 720 else Colorspace.ITU601
    return np.asarray(frame.to_ndarray(format="rgb24", src_colorspace=matrix), dtype=np.uint8)


def read_video(path: Path) -> Iterator[NDArray[np.uint8]]:
    """Pictures of a video in order, (H, W, 3) sRGB uint8, decoded one at a time.

    Raises
    ------
    InputError
        The file is no video, is truncated or damaged; the message has the number of frames read.
    """
    path = Path(path)
    count = packets = 0
    with _open(path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        try:
            for packet in container.demux(stream):
                packets += packet.size > 0
                for frame in packet.decode():
                    if frame.is_corrupt:
                        raise InputError(f"{path}: damaged after {count} frames")
                    yield _picture(frame)
                    count += 1
        except av.error.FFmpegError as error:
            raise InputError(f"{path}: damaged or truncated after {count} frames ({error.strerror})") from error
        if packets < stream.frames:  # the index promises more than the file holds
            raise InputError(f"{path}: truncated after {count} of {stream.frames} frames")


def frame_times(path: Path) -> NDArray[np.float64]:
    """Time of each frame [s] from the packets, without decoding."""
    stamps: list[int] = []
    with _open(path) as container:
        stream = container.streams.video[0]
        expected, base = stream.frames, stream.time_base
        try:
            for packet in container.demux(stream):
                if packet.size and packet.pts is not None:
                    stamps.append(packet.pts)
                if packet.is_corrupt:
                    raise InputError(f"{path}: truncated after {len(stamps)} frames")
        except av.error.FFmpegError as error:
            raise InputError(f"{path}: truncated after {len(stamps)} frames ({error.strerror})") from error
    if not stamps or len(stamps) < expected:
        raise InputError(f"{path}: expected {expected or 'some'} frames, got {len(stamps)} (truncated?)")
    return np.asarray((np.sort(stamps) - min(stamps)) * float(base), dtype=np.float64)


@dataclass(kw_only=True)
class _Stream:
    """Pictures by number where numbers mostly ascend: going back starts the file again."""

    path: Path
    _next: int = 0
    _pictures: Iterator[NDArray[np.uint8]] = field(default_factory=lambda: iter(()))

    def __call__(self, index: int) -> NDArray[np.uint8]:
        if index < self._next or self._next == 0:
            self._pictures, self._next = read_video(self.path), 0
        for picture in self._pictures:
            self._next += 1
            if self._next == index + 1:
                return picture
        raise InputError(f"{self.path}: frame {index}: got {self._next} frames only (truncated?)")


def _approximations(horizon: Horizon, camera_height_m: float, fov_deg: float) -> list[str]:
    found = f"found in {horizon.votes} pictures" if horizon.votes else "not found, taken at the middle"
    return [
        f"One camera without calibration: horizontal field of view taken as {fov_deg:g} degrees, no distortion.",
        f"Horizon {found}: row {horizon.row:.1f}; roll taken as 0.",
        f"Depth below the horizon is that of a level road {camera_height_m:g} m under the camera; regions without the "
        "colours of road, grass or earth stand upright on it; all above the horizon is far; slopes are wrong.",
        "The camera's motion is not known: weather that is anchored to the world moves with the camera.",
    ]


def open_video(path: Path, *, camera_height_m: float = 1.5, fov_deg: float = 60.0) -> Source:
    """Open a video of one camera that looks ahead over a road; geometry is taken from the ground plane.

    Parameters
    ----------
    path
        Any video file that FFmpeg reads.
    camera_height_m
        Height of the camera above the road [m].
    fov_deg
        Horizontal field of view [degrees].

    Raises
    ------
    InputError
        The file is no video or truncated, or a parameter is out of range.
    """
    path = Path(path)
    if not 0 < camera_height_m < 100:
        raise InputError(f"camera_height_m: expected a height above the road in metres, got {camera_height_m}")
    if not 1 <= fov_deg <= 170:
        raise InputError(f"fov_deg: expected 1 to 170 degrees, got {fov_deg}")
    times = frame_times(path)
    chosen = set(np.linspace(0, len(times) - 1, HORIZON_FRAMES).astype(int).tolist())
    horizon, (height, width) = find_horizon(
        picture for index, picture in enumerate(read_video(path)) if index in chosen
    )
    focal = width / 2 / np.tan(np.deg2rad(fov_deg) / 2)
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    info = ClipInfo(
        name=path.stem,
        width=width,
        height=height,
        K=np.tile(K, (len(times), 1, 1)),
        camera_to_world=np.tile(level_pose(horizon.row, K), (len(times), 1, 1)),
        times=times,
        provenance={
            "rgb": path.name,
            "depth": "level road under the camera; upright things on it",
            "K": f"assumed: {fov_deg:g} degrees wide",
            "camera_to_world": "pitch from the horizon; no motion",
        },
        approximations=_approximations(horizon, camera_height_m, fov_deg),
    )
    return Source(
        info=info,
        rgb=_Stream(path=path),
        fingerprint=fingerprint([path], "video", camera_height_m, fov_deg),
        camera_height_m=camera_height_m,
    )


class VideoWriter:
    """Writes pictures as H.264 (yuv420p, BT.709), one at a time; the file appears only when all of it is written.

    Use it in a `with` block: an error inside deletes what was written. Sides of odd length are continued by one row
    or column of the edge, since 4:2:0 has a chroma sample for every two pixels.

    Parameters
    ----------
    path
        The file; its suffix chooses the container (.mp4, .mkv, …).
    fps
        Frames a second.

    Raises
    ------
    InputError
        The file cannot be written, the disk is full, or pictures change in size.
    """

    def __init__(self, path: str | Path, *, fps: float) -> None:
        self.path = Path(path)
        if not 0 < fps <= 1000:
            raise InputError(f"fps: expected frames a second within (0, 1000], got {fps}")
        self.fps = Fraction(fps).limit_denominator(10_000)
        self._shape: tuple[int, ...] | None = None
        self._stream: Any = None
        self._exit = contextlib.ExitStack()
        self._temporary = self._exit.enter_context(replacing(self.path))
        self._closed = False
        try:
            with self._told():
                self._container = av.open(
                    str(self._temporary), "w", format=_container_format(self.path), options={"movflags": "+faststart"}
                )
        except InputError:
            self.__exit__(InputError, None, None)
            raise

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except (av.error.FFmpegError, OSError) as error:
            raise InputError(f"{self.path}: cannot be written ({error.strerror or error})") from error

    def _start(self, height: int, width: int) -> None:
        stream = self._container.add_stream("libx264", rate=self.fps, options={"crf": str(CRF)})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        context = stream.codec_context
        context.colorspace = Colorspace.ITU709
        context.color_range = ColorRange.MPEG
        context.color_primaries = ColorPrimaries.BT709
        context.color_trc = ColorTrc.BT709
        self._stream = stream

    def write(self, rgb: NDArray[np.uint8]) -> None:
        """Append a picture, (H, W, 3) sRGB uint8, of the same size as those before."""
        if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.shape != (self._shape or rgb.shape):
            expected = self._shape or "(H, W, 3)"
            raise InputError(f"{self.path}: expected a picture {expected} uint8, got {rgb.shape} {rgb.dtype.name}")
        self._shape = rgb.shape
        even = np.pad(rgb, ((0, rgb.shape[0] % 2), (0, rgb.shape[1] % 2), (0, 0)), mode="edge")
        with self._told():
            if self._stream is None:
                self._start(*even.shape[:2])
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            yuv = frame.reformat(format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG)
            self._container.mux(self._stream.encode(yuv))

    def close(self) -> None:
        """Write what is left and put the file in its place."""
        self.__exit__(None, None, None)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._closed:
            return
        self._closed = True
        if kind is not None:
            self._abandon(kind, error, trace)
            return
        try:
            with self._told():
                if self._stream is None:
                    raise InputError(f"{self.path}: expected at least one picture, got none")
                self._container.mux(self._stream.encode())
                self._container.close()
        except InputError as failed:
            self._abandon(InputError, failed, failed.__traceback__)
            raise
        self._exit.close()

    def _abandon(self, kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
        with contextlib.suppress(AttributeError, av.error.FFmpegError, OSError):
            self._container.close()
        with contextlib.suppress(InputError):
            self._exit.__exit__(kind, error, trace)


def _container_format(path: Path) -> str:
    formats = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska"}
    if path.suffix.lower() not in formats:
        raise InputError(f"{path}: expected a video file ending in {', '.join(formats)}")
    return formats[path.suffix.lower()]
