"""Flicker: what changes from frame to frame although the surface that is looked at is the same.

Two measures. `Flicker` follows surface points from one frame to the next by depth and poses, so that it takes the
motion of the camera out; what is left is flicker, light that moves, and errors of depth and sampling. The source has
these errors too: its own number stands beside the edit's. `static_variance` is for a camera that stands still.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.luminance import check_picture
from eval.score import Score
from eval.values import Undefined, Value
from eval.view import Array, View

STILL_M, STILL_RAD = 0.01, 1e-3  # what a camera that stands still may move by
FAR_OUT = 16.0  # [px]
NOTHING_SHARED = Undefined("no surface is seen in both frames")
ONE_FRAME = Undefined("one frame only")


class Place(NamedTuple):
    """Where the surfaces of one view are in another; all (H, W)."""

    u: NDArray[np.float32]  # [px]
    v: NDArray[np.float32]
    z: Array  # depth there [m]; NaN behind the camera


class Change(NamedTuple):
    """A pair of successive frames: sums over the pixels that both show."""

    ref: float  # sum of the mean absolute difference over the channels [codes]
    gen: float
    seen: int  # pixels
    all: int


def place(now: View, other: View) -> Place:
    """Project every surface point of a view into another one by depth and poses."""
    to_other = np.linalg.inv(other.camera_to_world) @ now.camera_to_world
    points = (now.rays() * now.depth[..., None]) @ to_other[:3, :3].T + to_other[:3, 3]
    z = np.where(points[..., 2] > 0, points[..., 2], np.nan)
    u = other.K[0, 0] * points[..., 0] / z + other.K[0, 2]
    v = other.K[1, 1] * points[..., 1] / z + other.K[1, 2]
    height, width = other.shape
    return Place(_near_picture(u, width), _near_picture(v, height), z)


def _near_picture(x: Array, size: int) -> NDArray[np.float32]:
    """Places as OpenCV can take them: those far outside just outside, those that do not exist outside, too."""
    return np.asarray(np.clip(np.nan_to_num(x, nan=-FAR_OUT), -FAR_OUT, size + FAR_OUT), dtype=np.float32)


def _look_up(plane: NDArray[Any], at: Place, how: int = cv2.INTER_LINEAR) -> NDArray[Any]:
    """Values of a plane at places, 0 outside of it."""
    return np.asarray(cv2.remap(plane, at.u, at.v, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0))


def _found(now: View, other: View, at: Place, agreement: float) -> NDArray[np.bool_]:
    """Where the other view has the surface at the place, and neither calls it sky or moving."""
    still = _look_up(_still(other).astype(np.uint8), at, cv2.INTER_NEAREST) > 0
    depth = _look_up(other.depth.astype(np.float32), at)
    return np.asarray(_still(now) & still & (np.abs(depth - at.z) < agreement * at.z))


def _still(view: View) -> NDArray[np.bool_]:
    return ~view.sky & ~view.moving


def shared(now: View, before: View, *, agreement: float) -> tuple[Place, NDArray[np.bool_]]:
    """Places of a view's surfaces in the view before, and where both show the same surface, (H, W).

    Tested both ways: the view before has the same depth there within a share `agreement`, and its pixel there finds its
    own surface in the present view, too. A surface that only one of them sees fails one of the tests.
    """
    at = place(now, before)
    back = _found(before, now, place(before, now), agreement)
    return at, _found(now, before, at, agreement) & (_look_up(back.astype(np.uint8), at, cv2.INTER_NEAREST) > 0)


def change(
    before: NDArray[np.uint8], now: NDArray[np.uint8], at: Place, seen: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Absolute difference [codes] of the pixels that are seen, (n, 3), the picture before being warped to this one."""
    warped = _look_up(before.astype(np.float32), at)
    return np.asarray(np.abs(warped[seen] - now[seen]))


@dataclass(frozen=True, kw_only=True)
class Flicker:
    """Warp error: mean absolute difference [codes of 0 to 255] of surface points in successive frames.

    The mean is over the three channels and over all pixels of all pairs that show the same surface in both frames; sky
    and what moves are left out. Beside it: that of the source on the same pixels, and the ratio of the two.

    What moves the number: contrast (a low one hides flicker), noise, errors of depth at edges, the frame rate; and
    headlights, which move with the camera.

    Parameters
    ----------
    agreement
        Share by which two depths of one surface may differ.
    """

    agreement: float = 0.02

    def frame(
        self,
        ref: tuple[NDArray[np.uint8], NDArray[np.uint8]],
        gen: tuple[NDArray[np.uint8], NDArray[np.uint8]],
        views: tuple[View, View],
    ) -> Change:
        """Change between two successive frames.

        Parameters
        ----------
        ref, gen
            The frame before and the present one of source and edit, (H, W, 3) sRGB uint8.
        views
            Their geometry.

        Raises
        ------
        MetricError
            A picture is of another kind, or of another size than the depth.
        """
        for name, pictures in (("flicker: ref", ref), ("flicker: gen", gen)):
            for picture, view in zip(pictures, views, strict=True):
                check_picture(name, picture)
                view.check(name, picture)
        before, now = views
        at, seen = shared(now, before, agreement=self.agreement)
        sums = [float(change(*pictures, at, seen).sum(dtype=np.float64)) / 3 for pictures in (ref, gen)]
        return Change(sums[0], sums[1], int(np.count_nonzero(seen)), seen.size)

    def pool(self, records: Sequence[Change]) -> Score:
        """Mean over the pixels of all pairs; `frames` has the edit's mean of every pair. A single frame has no pair."""
        if not records:
            return Score(value=ONE_FRAME)
        seen, pixels = sum(record.seen for record in records), sum(record.all for record in records)
        ref = _mean(sum(record.ref for record in records), seen)
        gen = _mean(sum(record.gen for record in records), seen)
        return Score(
            value=gen,
            frames=tuple(_mean(record.gen, record.seen) for record in records),
            others={
                "source": ref,
                "edit over source": _ratio(gen, ref),
                "share of pixels": seen / pixels,
            },
        )

    def summands(self, records: Sequence[Change]) -> Array:
        """The edit's change, and pixels."""
        return np.array([(record.gen, record.seen) for record in records], dtype=np.float64)

    def of_sums(self, sums: Array) -> Value:
        """Mean over the pixels."""
        return _mean(float(sums[0]), int(sums[1]))


PRESETS = {"depth and poses": Flicker()}


def _mean(total: float, count: int) -> Value:
    return total / count if count else NOTHING_SHARED


def _ratio(gen: Value, ref: Value) -> Value:
    if isinstance(gen, Undefined) or isinstance(ref, Undefined):
        return NOTHING_SHARED
    return gen / ref if ref else Undefined("the source does not change")


def static_variance(pictures: Iterable[NDArray[np.uint8]], views: Iterable[View]) -> Score:
    """Variance over time [codes^2] of what a camera that stands still sees: sum_t (x_t - mean x)^2 / N.

    Mean over the channels and over the pixels that are neither sky nor moving in any frame. Sums are of whole numbers,
    so nothing cancels out; memory does not grow with the video. Undefined where the camera moves (by more than 1 cm or
    1 mrad), with fewer than two frames, or where no pixel is still.

    Parameters
    ----------
    pictures
        (H, W, 3) sRGB uint8.
    views
        Their geometry, as many.

    Raises
    ------
    MetricError
        A picture is of another kind, or of another size than the depth.
    """
    count, first = 0, None
    for picture, view in zip(pictures, views, strict=True):
        check_picture("flicker", picture)
        view.check("flicker", picture)
        if first is None:
            first, still = view, _still(view)
            total = np.zeros(picture.shape, np.int64)
            squares = np.zeros_like(total)
        if view.shape != first.shape:
            raise MetricError(f"flicker: expected frames of one size, got {first.shape} and {view.shape}")
        if _moved(first, view):
            return Score(value=Undefined("the camera moves"))
        count += 1
        still &= _still(view)
        total += picture
        squares += np.square(picture, dtype=np.int64)
    if first is None or count < 2:
        return Score(value=ONE_FRAME)
    if not still.any():
        return Score(value=Undefined("no pixel is still"))
    variance = (count * squares[still] - total[still] ** 2) / count**2
    share = float(still.mean())
    return Score(value=float(variance.mean()), others={"share of pixels": share, "frames": float(count)})


def _moved(first: View, view: View) -> bool:
    """Whether the camera is not where it was, or looks elsewhere."""
    turn = first.camera_to_world[:3, :3].T @ view.camera_to_world[:3, :3]
    step = first.camera_to_world[:3, 3] - view.camera_to_world[:3, 3]
    # |R - 1| = 2 sqrt(2) sin(angle / 2) in the norm of Frobenius: to first order sqrt(2) times the angle.
    angle = float(np.linalg.norm(turn - np.eye(3))) / np.sqrt(2)
    return bool(np.linalg.norm(step) > STILL_M or angle > STILL_RAD)
