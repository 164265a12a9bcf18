"""A frame of the street: exact planes at pixel centres, and a sunlit picture with smoothed edges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.camera import Camera
from aw4d.gbuffer import GBuffer
from aw4d.street import layout, sky
from aw4d.street.cars import Car
from aw4d.street.noise import smoothstep
from aw4d.street.parts import Material, Part
from aw4d.street.shapes import Rays
from aw4d.street.textures import PAINTERS, Samples, Surface, blank
from aw4d.street.trace import Grid, Seen, look, sun_blocked, turn

Array = NDArray[Any]

SKY_DEPTH_M = 260.0
_GLARE = 4.0  # a highlight counts no more than this in a mean, or its edge would be a staircase of white
_CONTRAST = 0.06  # difference between neighbours, in display code, from which on an edge is smoothed
_AROUND = ((-0.15, -0.375), (-0.3, 0.3), (0.375, 0.075))  # with the centre: four rays that share no row or column [px]


@dataclass(frozen=True)
class Shot:
    """Rays of one exposure: camera, all that stands around it, directions in the camera frame (z = 1), and their grid."""

    camera: Camera
    parts: Sequence[Part]
    cars: Sequence[Car]
    direction: Array  # (3, N)
    grid: Grid
    pitch: float  # distance of neighbouring samples [px]

    @property
    def world_direction(self) -> Array:
        """Directions in the world, (3, N)."""
        return turn(self.camera.camera_to_world[:3, :3], self.direction)

    def look(self) -> Seen:
        """What every ray meets."""
        eye = self.camera.camera_to_world[:3, 3]
        d = self.world_direction
        rays = Rays((float(eye[0]), float(eye[1]), float(eye[2])), (d[0], d[1], d[2]))
        return look(self.parts, self.camera, rays, self.grid)


@dataclass(frozen=True)
class Lit:
    """What a shot shows, ray by ray: surface, world normal facing the eye, sun blocked, radiance."""

    seen: Seen
    normal: Array  # (3, N)
    surface: Surface
    blocked: NDArray[np.bool_]
    rgb: NDArray[np.float32]  # (3, N)


def full_shot(index: int, camera: Camera) -> Shot:
    """One ray through every pixel's centre."""
    height, width = camera.shape
    grid = Grid(height, width, np.arange(height * width + 1))
    direction = np.ascontiguousarray(camera.rays().reshape(-1, 3).T)
    return Shot(camera, layout.parts(index), layout.cars(index), direction, grid, 1.0)


def _around_shot(shot: Shot, pixels: NDArray[np.bool_]) -> Shot:
    """Four rays through each of the marked pixels, off their centres."""
    camera = shot.camera
    row, column = np.nonzero(pixels)
    counts = np.zeros(pixels.size + 1, np.int64)
    np.cumsum(pixels.ravel() * len(_AROUND), out=counts[1:])
    offset = np.array(_AROUND)
    u = (column[:, None] + offset[:, 0]).ravel()
    v = (row[:, None] + offset[:, 1]).ravel()
    K = camera.K
    direction = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.size)])
    return Shot(camera, shot.parts, shot.cars, direction, Grid(*camera.shape, counts), 0.5)


def _segments(part: Array) -> tuple[Array, Iterator[tuple[int, slice]]]:
    """Order of the rays by part, and the run of each part that is seen."""
    order = np.argsort((part + 1).astype(np.uint16), kind="stable")
    ends = np.cumsum(np.bincount(part + 1))
    runs = ((n - 1, slice(int(ends[n - 1]), int(ends[n]))) for n in range(1, len(ends)) if ends[n] > ends[n - 1])
    return order, runs


def light(shot: Shot) -> Lit:
    """Follow the rays, paint what they meet, and light it."""
    seen = shot.look()
    order, runs = _segments(seen.part)
    first = int(np.count_nonzero(seen.part < 0))  # the sky's rays come first
    ray = shot.world_direction[:, order]
    depth, face = seen.depth[order], seen.face[order]
    eye = shot.camera.camera_to_world[:3, 3]
    point = eye[:, None] + np.where(np.isfinite(depth), depth, 0) * ray
    length = np.sqrt(np.einsum("cn,cn->n", ray, ray))
    normal = -ray / length
    runs_seen = list(runs)
    for number, run in runs_seen:
        x, y, z = point[:, run]
        normal[:, run] = shot.parts[number].shape.normal((x, y, z), face[run])
    away = np.einsum("cn,cn->n", normal, ray) > 0
    normal[:, away] *= -1

    surface = _paint(shot, runs_seen, point, ray, normal, depth, face)
    on = slice(first, None)
    facing = sky.SUN @ normal[:, on]
    hidden = facing <= 0
    hidden |= sun_blocked(shot.parts, point[:, on], ~hidden)
    unit = (ray / length).astype(np.float32)
    rgb = np.empty(ray.shape, np.float32)
    rgb[:, :first] = sky.sky(unit[:, :first])
    ground = _contact_shade(shot, runs_seen, point)
    surface.openness[:] *= ground
    sub = Surface(*(a[..., on] for a in _fields(surface)))
    leafy = _leaf_mask(shot, runs_seen, order.size)[on]
    rgb[:, on] = _radiance(sub, normal[:, on].astype(np.float32), unit[:, on], hidden, leafy)
    blocked = np.zeros(order.size, np.bool_)
    blocked[on] = hidden
    back = np.empty_like(order)
    back[order] = np.arange(order.size)
    painted = Surface(*(a[..., back] for a in _fields(surface)))
    return Lit(seen, normal[:, back], painted, blocked[back], rgb[:, back])


def _fields(surface: Surface) -> tuple[Array, ...]:
    return surface.albedo, surface.roughness, surface.metallic, surface.emissive, surface.openness


def _leaf_mask(shot: Shot, runs: list[tuple[int, slice]], count: int) -> Array:
    mask = np.zeros(count, np.bool_)
    for number, run in runs:
        mask[run] = shot.parts[number].material is Material.LEAVES
    return mask


def _footprint(shot: Shot, ray: Array, normal: Array, depth: Array) -> Array:
    """Extent of each sample on its surface along the world axes [m], (3, N): the tangent plane's pixel derivatives."""
    R, K = shot.camera.camera_to_world[:3, :3].astype(np.float32), shot.camera.K
    n_d = np.minimum(np.einsum("cn,cn->n", normal, ray), -1e-3)
    total = np.zeros(ray.shape, np.float32)
    for axis in range(2):
        e = R[:, axis]
        step = e[:, None] - ray * ((e @ normal) / n_d)
        total += np.abs(step) * np.float32(shot.pitch / K[axis, axis])
    return np.maximum(total * depth, 1e-5)


def _paint(shot: Shot, runs: list[tuple[int, slice]], point: Array, ray: Array, normal: Array, depth: Array, face: Array) -> Surface:
    """Surface of every sample; the sky's stay as `blank` made them, but black."""
    surface = blank(depth.size)
    surface.albedo[:] = 0
    surface.roughness[:] = 1
    if not runs:
        return surface
    on = slice(runs[0][1].start, None)
    foot = np.zeros(point.shape, np.float32)
    foot[:, on] = _footprint(shot, ray[:, on].astype(np.float32), normal[:, on].astype(np.float32), depth[on].astype(np.float32))
    point32 = point.astype(np.float32)
    for number, run in runs:
        part = shot.parts[number]
        out = Surface(*(a[..., run] for a in _fields(surface)))
        out.roughness[:] = 0.9
        PAINTERS[part.material](part, Samples(point32[:, run], normal[:, run], foot[:, run], face[run]), out)
    np.clip(surface.albedo, 0, 1, out=surface.albedo)
    return surface


def _contact_shade(shot: Shot, runs: list[tuple[int, slice]], point: Array) -> Array:
    """Share of the sky's light that the cars leave to the road beside and beneath them."""
    share = np.ones(point.shape[1], np.float32)
    for number, run in runs:
        if shot.parts[number].material is not Material.ASPHALT:
            continue
        x, z = point[0, run].astype(np.float32), point[2, run].astype(np.float32)
        order = np.argsort(x)
        sorted_x = x[order]
        for car in shot.cars:
            length, _, width = car.size
            lo, hi = np.searchsorted(sorted_x, (car.x - length / 2 - 1.5, car.x + length / 2 + 1.5))
            near = order[lo:hi]
            dx = np.maximum(np.abs(x[near] - car.x) - length / 2 + 0.15, 0)
            dz = np.maximum(np.abs(z[near] - car.z) - width / 2 + 0.2, 0)
            share[run.start + near] *= 1 - 0.85 * np.exp(-np.hypot(dx, dz) / 0.32)
    return share


def _radiance(s: Surface, normal: Array, view: Array, hidden: Array, leafy: Array) -> Array:
    """Outgoing light: sun with shadows, sky light with `openness`, and mirrored surroundings on glossy surfaces."""
    towards = sky.SUN.astype(np.float32)
    NoL = np.where(hidden, 0, towards @ normal).astype(np.float32)
    sun = sky.SUN_COLOUR[:, None] * NoL
    rgb = s.albedo * (1 - s.metallic) * (sun + sky.ambient(normal) * s.openness)
    rgb[:, leafy] += _through_leaves(s.albedo[:, leafy], normal[:, leafy], s.openness[leafy])
    glossy = np.flatnonzero(s.roughness < 0.45)
    if glossy.size:
        rgb[:, glossy] += _gloss(s, normal, view, NoL, glossy)
    return rgb + s.emissive


def _through_leaves(albedo: Array, normal: Array, openness: Array) -> Array:
    """Light that a crown scatters on: from the sky behind a leaf, and of the sun through and between the leaves."""
    behind = 0.35 * sky.ambient(-normal) + 0.22 * sky.SUN_COLOUR[:, None] * (0.6 + 0.4 * (sky.SUN @ normal))
    return (albedo * behind * openness).astype(np.float32)


def _gloss(s: Surface, normal: Array, view: Array, NoL: Array, index: Array) -> Array:
    """Mirrored surroundings and the sun's highlight (GGX, Walter et al. 2007; Fresnel after Schlick 1994)."""
    n, v = normal[:, index], -view[:, index]
    alpha2 = np.maximum(s.roughness[index], 0.09) ** 4
    NoV = np.clip(np.einsum("cn,cn->n", n, v), 1e-3, 1)
    F0 = 0.04 + (s.albedo[:, index] - 0.04) * s.metallic[index]
    fresnel = F0 + (1 - F0) * (1 - NoV) ** 5
    mirror = sky.mirrored(2 * NoV * n - v) * s.openness[index]
    half = v + sky.SUN.astype(np.float32)[:, None]
    half /= np.linalg.norm(half, axis=0)
    NoH = np.clip(np.einsum("cn,cn->n", n, half), 0, 1)
    lobe = alpha2 / (NoH**2 * (alpha2 - 1) + 1) ** 2 / 4
    return fresnel * mirror + F0 * np.minimum(lobe * NoL[index], 40) * sky.SUN_COLOUR[:, None]


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


def picture(shot: Shot, centre: Lit) -> NDArray[np.float32]:
    """The picture, (H, W, 3): the pixel's centre, or the mean of four rays where the centre differs from a neighbour."""
    height, width = shot.camera.shape
    rgb = np.ascontiguousarray(centre.rgb.T).reshape(height, width, 3)
    marked = _edges(rgb)
    if marked.any():
        more = light(_around_shot(shot, marked))
        total = np.minimum(rgb[marked], _GLARE) + np.minimum(more.rgb, _GLARE).reshape(3, -1, len(_AROUND)).sum(axis=-1).T
        rgb[marked] = total / (1 + len(_AROUND))
    return rgb


def planes(shot: Shot, lit: Lit, time: float) -> GBuffer:
    """All planes of a frame."""
    height, width = shot.camera.shape
    none = lit.seen.part < 0

    def image(values: Array, dtype: type) -> Array:
        return np.ascontiguousarray(np.moveaxis(values.astype(dtype).reshape(*values.shape[:-1], height, width), -3, -1)) if values.ndim == 2 else values.astype(dtype).reshape(height, width)

    normal = turn(shot.camera.camera_to_world[:3, :3].T, lit.normal)
    normal[:, none] = np.array([[0.0], [0.0], [-1.0]])
    vehicle = np.array([p.vehicle for p in shot.parts] + [0])
    lamp = np.array([p.street_light for p in shot.parts] + [0])
    asphalt = np.array([p.material is Material.ASPHALT for p in shot.parts] + [False])
    return GBuffer(
        {
            "rgb": picture(shot, lit),
            "depth": image(np.where(none, SKY_DEPTH_M, lit.seen.depth), np.float32),
            "normal": image(normal, np.float32),
            "albedo": image(lit.surface.albedo, np.float32),
            "roughness": image(lit.surface.roughness, np.float32),
            "metallic": image(lit.surface.metallic, np.float32),
            "emissive": image(lit.surface.emissive, np.float32),
            "sky": image(none, np.bool_),
            "road": image(asphalt[lit.seen.part], np.bool_),
            "vehicle": image(vehicle[lit.seen.part], np.int32),
            "street_light": image(lamp[lit.seen.part], np.int32),
        },
        camera=shot.camera,
        time=time,
    )
