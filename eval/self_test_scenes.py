"""Scenes of the self test: small, made up, and exact, so that what a metric must say of them is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eval.box_iou import Rectangle, iou, projected, visible
from eval.boxes import Array, Camera, cuboid
from eval.flicker import Flicker, static_variance
from eval.luminance import LINEAR
from eval.score import Score
from eval.shadow import Shadow
from eval.values import Value
from eval.view import View
from eval.visibility import KOSCHMIEDER, DarkLevels, Visibility

Picture = NDArray[np.uint8]

SIDE = 64  # of pictures [px]


def squares() -> tuple[Picture, Picture]:
    """A square and the same square elsewhere, (64, 64, 3)."""
    first = np.zeros((SIDE, SIDE, 3), np.uint8)
    first[8:24, 8:24] = 255
    return first, np.roll(first, 30, axis=(0, 1))


def beside() -> tuple[Array, Camera]:
    """A car that the camera passes: its rear is behind the lens."""
    pose = np.eye(4)
    pose[:3, 3] = 2.5, 0.9, 2
    camera = Camera(K=np.array([[1000, 0, 640], [0, 1000, 352], [0, 0, 1]]), width=1280, height=704)
    return cuboid(pose, (2, 1.6, 4.5)), camera


def printed_against_visible() -> Value:
    """IoU of the two rectangles of that car."""
    corners, camera = beside()
    printed, seen = projected(corners, camera.K), visible(corners, camera)
    assert isinstance(printed, Rectangle)
    assert isinstance(seen, Rectangle)
    return iou(printed, seen)


def video(step: int, frames: int = 4) -> list[Picture]:
    """A picture that stands still, every second frame brighter by `step` codes."""
    return [squares()[0] // 2 + np.uint8(step * (i % 2)) for i in range(frames)]


def wall() -> View:
    """What a camera that does not move sees: a wall 10 m ahead."""
    K, nothing = np.array([[SIDE, 0, SIDE / 2], [0, SIDE, SIDE / 2], [0, 0, 1]]), np.zeros((SIDE, SIDE), np.bool_)
    return View(depth=np.full((SIDE, SIDE), 10.0), K=K, sky=nothing, moving=nothing)


def flicker(step: int) -> Score:
    """Of that wall, with that picture on it."""
    metric, view, still = Flicker(), wall(), video(0)
    pairs = zip(pairwise(still), pairwise(video(step)), strict=True)
    return metric.pool([metric.frame(ref, gen, (view, view)) for ref, gen in pairs])


def variance(step: int) -> Value:
    """Over time, of the same."""
    return static_variance(video(step), [wall()] * 4).value


def shadow(share: float) -> Score:
    """Of an edit in which the logarithm of luminance rises by this share of what it rises in the source."""
    rise = np.linspace(-1, 1, SIDE)
    ref, gen = (_grey(0.3 * np.exp(slope * rise)) for slope in (1.0, share))
    inside = np.zeros((SIDE, SIDE), np.bool_)
    inside[8:-8, 8:-8] = True
    metric = Shadow()
    return metric.pool([metric.frame(ref, gen, inside)])


def _grey(columns: Array) -> Picture:
    """A picture of these linear luminances, each in a column of its own."""
    codes = np.searchsorted((LINEAR[1:] + LINEAR[:-1]) / 2, columns).astype(np.uint8)
    return np.broadcast_to(codes[None, :, None], (SIDE, SIDE, 3)).copy()


def visibility(metres: float) -> Value:
    """Of dark surfaces up to 100 m and a sky whose levels are Koschmieder's to the last digit."""
    ranges = np.linspace(10, 100, 30)
    level = 0.5 * (1 - 0.9 * np.exp(-KOSCHMIEDER / metres * ranges))
    return Visibility().pool([DarkLevels(np.full(30, 200.0), ranges, level, 0.5)]).value
