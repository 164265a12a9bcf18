"""A frame of the street: exact planes at pixel centres, and a sunlit picture with smoothed edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from aw4d.camera import Camera
from aw4d.gbuffer import GBuffer
from aw4d.street import layout, sky
from aw4d.street.cars import Car
from aw4d.street.light import along_sun, contact_shade, dot, radiance
from aw4d.street.parts import Material, Part
from aw4d.street.shapes import Rays
from aw4d.street.surface import Samples, Surface, blank
from aw4d.street.textures import FILTERED, PAINTERS
from aw4d.street.trace import Grid, look, sun_blocked, turn

Array = NDArray[Any]
Runs = list[tuple[int, slice]]  # number of a part, and where its rays are

SKY_DEPTH_M = 102.7  # [m] 99th percentile of what is not sky, in every 8th frame of the clip at 1280x704
_CONTRAST = 0.06  # difference between neighbours, of square roots of radiance, from which on an edge is smoothed
_GLARE = 4.0  # a highlight counts no more than this in a mean, or its edge would be a staircase of white
_AROUND = ((-0.15, -0.375), (-0.3, 0.3), (0.375, 0.075))  # with the centre: four rays, no two in a row or column [px]


@dataclass(frozen=True)
class Shot:
    """Rays of one exposure: the camera, what stands around it, and directions in the camera frame, sorted by pixel."""

    camera: Camera
    parts: Sequence[Part]
    cars: Sequence[Car]
    direction: Array  # (3, N), z = 1
    grid: Grid
    pitch: float  # distance of neighbouring rays [px]


@dataclass(frozen=True)
class Hits:
    """What the rays of a shot meet, sorted by part, the sky first; `order` says which ray each one is."""

    order: Array
    runs: Runs
    first: int  # the first that is not sky
    ray: Array  # (3, N) direction in the world, camera z = 1
    depth: Array  # (N,) [m], infinite in the sky
    point: Array  # (3, N) world [m]
    face: Array  # (N,)
    normal: Array  # (3, N) world, facing the eye


def full_shot(index: int, camera: Camera) -> Shot:
    """One ray through every pixel's centre."""
    height, width = camera.shape
    direction = np.ascontiguousarray(camera.rays().reshape(-1, 3).T)
    grid = Grid(height, width, np.arange(height * width + 1))
    return Shot(camera, layout.parts(index), layout.cars(index), direction, grid, 1.0)


def _around_shot(shot: Shot, pixels: NDArray[np.bool_]) -> Shot:
    """More rays through each of the marked pixels, off their centres."""
    K = shot.camera.K
    row, column = np.nonzero(pixels)
    starts = np.zeros(pixels.size + 1, np.int64)
    np.cumsum(pixels.ravel() * len(_AROUND), out=starts[1:])
    offset = np.array(_AROUND)
    u = (column[:, None] + offset[:, 0]).ravel()
    v = (row[:, None] + offset[:, 1]).ravel()
    direction = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.size)])
    return Shot(shot.camera, shot.parts, shot.cars, direction, Grid(*shot.camera.shape, starts), 0.5)


def follow(shot: Shot) -> Hits:
    """Follow every ray to what it meets."""
    x, y, z = (float(c) for c in shot.camera.camera_to_world[:3, 3])
    ray = turn(shot.camera.camera_to_world[:3, :3], shot.direction)
    seen = look(shot.parts, shot.camera, Rays((x, y, z), (ray[0], ray[1], ray[2])), shot.grid)
    order = np.argsort((seen.part + 1).astype(np.uint16), kind="stable")
    counts = np.bincount(seen.part + 1, minlength=len(shot.parts) + 1)
    ends = np.cumsum(counts)
    runs = [(int(n), slice(int(ends[n]), int(ends[n + 1]))) for n in np.flatnonzero(counts[1:])]
    first = int(counts[0])

    ray, depth, face = ray[:, order], seen.depth[order], seen.face[order]
    point = np.zeros(ray.shape)
    point[:, first:] = np.array([[x], [y], [z]]) + depth[first:] * ray[:, first:]
    normal = np.empty(ray.shape, np.float32)
    normal[:, :first] = -ray[:, :first] / np.sqrt(dot(ray[:, :first], ray[:, :first]))
    for number, run in runs:
        px, py, pz = point[:, run]
        normal[:, run] = shot.parts[number].shape.normal((px, py, pz), face[run])
    normal *= np.where(dot(normal, ray) > 0, np.float32(-1), np.float32(1))
    return Hits(order, runs, first, ray, depth, point, face, normal)


def in_shadow(shot: Shot, hits: Hits) -> NDArray[np.bool_]:
    """Where no sunlight falls, in the order of the hits: the surface looks away from the sun, or a part is between."""
    hidden = along_sun(hits.normal) <= 0
    hidden[: hits.first] = True  # spares the sky's rays the search
    hidden |= sun_blocked(shot.parts, hits.point, ~hidden)
    hidden[: hits.first] = False
    return hidden


def paint(shot: Shot, hits: Hits) -> Surface:
    """Surface of every hit; the sky's is black and rough."""
    surface = blank(hits.order.size)
    point = hits.point.astype(np.float32)
    for number, run in hits.runs:
        part = shot.parts[number]
        spread = _footprint(shot, hits, run) if part.material in FILTERED else point[:, run]
        PAINTERS[part.material](
            part,
            Samples(point[:, run], hits.normal[:, run], spread, hits.face[run]),
            Surface(*(a[..., run] for a in surface)),
        )
        if part.material is Material.ASPHALT:
            surface.openness[run] *= contact_shade(point[0, run], point[2, run], shot.cars)
    np.clip(surface.albedo, 0, 1, out=surface.albedo)
    return surface


def _footprint(shot: Shot, hits: Hits, run: slice) -> Array:
    """Extent of each sample on its surface along the world axes [m], (3, N): the tangent plane's pixel derivatives."""
    ray, normal = hits.ray[:, run].astype(np.float32), hits.normal[:, run]
    facing = np.minimum(dot(normal, ray), np.float32(-1e-3))
    total = np.zeros(ray.shape, np.float32)
    for axis in range(2):
        e = shot.camera.camera_to_world[:3, axis].astype(np.float32)[:, None]
        step = e - ray * (dot(np.broadcast_to(e, normal.shape), normal) / facing)
        total += np.abs(step) * np.float32(shot.pitch / shot.camera.K[axis, axis])
    return np.maximum(total * hits.depth[run].astype(np.float32), np.float32(1e-5))


def expose(shot: Shot, hits: Hits, surface: Surface) -> Array:
    """Radiance of every ray of a shot, in the shot's own order, (N, 3)."""
    view = (hits.ray / np.sqrt(dot(hits.ray, hits.ray))).astype(np.float32)
    leafy = np.zeros(hits.order.size, np.bool_)
    for number, run in hits.runs:
        leafy[run] = shot.parts[number].material is Material.LEAVES
    first = slice(None, hits.first)
    on = slice(hits.first, None)
    rgb = np.empty(view.shape, np.float32)
    rgb[:, first] = sky.sky(view[:, first])
    seen = Surface(*(a[..., on] for a in surface))
    rgb[:, on] = radiance(seen, hits.normal[:, on], view[:, on], in_shadow(shot, hits)[on], leafy[on])
    return unsorted(hits, rgb)


def unsorted(hits: Hits, values: Array) -> Array:
    """Values of the hits, (N,) or (3, N), in the order of the shot's rays, (N,) or (N, 3)."""
    out = np.empty_like(values.T, order="C")
    out[hits.order] = values.T
    return out


def _edges(rgb: Array) -> NDArray[np.bool_]:
    """Pixels that differ visibly from a neighbour, (H, W, 3) to (H, W)."""
    code = np.sqrt(np.clip(rgb, 0, 1))
    marked = np.zeros(rgb.shape[:2], np.bool_)
    down = np.abs(np.diff(code, axis=0)).max(axis=-1) > _CONTRAST
    right = np.abs(np.diff(code, axis=1)).max(axis=-1) > _CONTRAST
    marked[1:] |= down
    marked[:-1] |= down
    marked[:, 1:] |= right
    marked[:, :-1] |= right
    return marked


def picture(shot: Shot, hits: Hits, surface: Surface) -> NDArray[np.float32]:
    """The picture, (H, W, 3): a pixel's centre, or the mean of four rays where it differs from a neighbour."""
    rgb = np.minimum(expose(shot, hits, surface), _GLARE).reshape(*shot.camera.shape, 3)
    marked = _edges(rgb)
    if marked.any():
        around = _around_shot(shot, marked)
        met = follow(around)
        more = np.minimum(expose(around, met, paint(around, met)), _GLARE)
        rgb[marked] = (rgb[marked] + more.reshape(-1, len(_AROUND), 3).sum(axis=1)) / (1 + len(_AROUND))
    return rgb


def planes(index: int, camera: Camera) -> GBuffer:
    """All planes of a frame."""
    shot = full_shot(index, camera)
    hits = follow(shot)
    surface = paint(shot, hits)
    sky_first = np.arange(hits.order.size) < hits.first
    normal = turn(camera.camera_to_world[:3, :3].T, hits.normal)
    normal[:, : hits.first] = np.array([[0.0], [0.0], [-1.0]])

    def plane(values: Array, dtype: DTypeLike) -> Array:
        return unsorted(hits, values.astype(dtype)).reshape(*camera.shape, *values.shape[:-1])

    def labels(of: Sequence[int]) -> Array:
        label = np.zeros(hits.order.size, np.int32)
        for number, run in hits.runs:
            label[run] = of[number]
        return label

    road = labels([part.material is Material.ASPHALT for part in shot.parts])
    return GBuffer(
        {
            "rgb": picture(shot, hits, surface),
            "depth": plane(np.where(sky_first, SKY_DEPTH_M, hits.depth), np.float32),
            "normal": plane(normal, np.float32),
            "albedo": plane(surface.albedo, np.float32),
            "roughness": plane(surface.roughness, np.float32),
            "metallic": plane(surface.metallic, np.float32),
            "emissive": plane(surface.emissive, np.float32),
            "sky": plane(sky_first, np.bool_),
            "road": plane(road, np.bool_),
            "vehicle": plane(labels([part.vehicle for part in shot.parts]), np.int32),
            "street_light": plane(labels([part.street_light for part in shot.parts]), np.int32),
        },
        camera=camera,
        time=index / layout.RATE,
    )


def shadow_mask(index: int, camera: Camera) -> NDArray[np.bool_]:
    """Where no sunlight falls, (H, W); False in the sky."""
    shot = full_shot(index, camera)
    hits = follow(shot)
    return unsorted(hits, in_shadow(shot, hits)).reshape(camera.shape)
