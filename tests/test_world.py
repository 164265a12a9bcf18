"""Places in the world: kernels know them far better than a float can tell, anywhere on earth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from aw4d.camera import Camera
from aw4d.world import anchor
from aw4d.world.anchor import TICKS
from reference_numpy.fbm import fbm
from reference_numpy.world import BLOCK, cells_of, places
from tests.device_code import run_kernel, with_header
from tests.fog_inputs import camera
from tests.ground_inputs import pose

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

WIDTH, HEIGHT = 128, 32
CELLS = 256
ORIGINS = [(0.0, 0.0, 0.0), (520_000.0, 110.0, -4_100_000.0), (-4e6, -3.0, 4e6), (-1e-3, 0.0, 1e-3)]
WEIGHT = np.array([0.5, 0.25, 0.125], dtype=np.float32)
KERNEL = """
__kernel void look(__global const float *depth, const float fx, const float fy, const float cx, const float cy,
                   __global const float *to_world, __global const float *to_world_lo,
                   __global const float *eye, __global const float *eye_lo, __global const int *block,
                   __global const float *weight, const int width, const int cells,
                   __global float *hi, __global float *lo, __global int *column, __global float *into,
                   __global int *row, __global float *across, __global float *noise_hi, __global float *noise_lo)
{
    const int i = get_global_id(0) * W;
    const floatw du = (float)(i % width) + LANES - cx;
    const floatw dv = (float)(i / width) - cy;
    const Place at = places(du, dv, LOADW(depth + i), fx, fy, to_world, to_world_lo, eye, eye_lo);
    floatw u, w;
    STOREW(at.x.hi, hi + i);
    STOREW(at.x.lo, lo + i);
    STOREW(cells_of(at.x, block[0], cells, &u), column + i);
    STOREW(cells_of(at.z, block[2], cells, &w), row + i);
    STOREW(u, into + i);
    STOREW(w, across + i);
    const Sharp noise = fbm(at, block, 16, weight, 3, 5, (floatw)(-1.0f));
    STOREW(noise.hi, noise_hi + i);
    STOREW(noise.lo, noise_lo + i);
}
"""


def look(backend: Any, eye: Camera, depth: np.ndarray, origin: tuple[float, float, float]) -> dict[str, np.ndarray]:
    """What a kernel makes of a picture's depths."""
    K, at = eye.K.astype(np.float32), anchor(eye, 0.0, origin)
    scalars = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    arrays = {name: at[name] for name in ("to_world", "to_world_lo", "eye", "eye_lo", "block")}
    given = {"depth": depth} | scalars | arrays | {"weight": WEIGHT, "width": np.int32(WIDTH), "cells": np.int32(CELLS)}
    made = dict.fromkeys(("hi", "lo", "column", "into", "row", "across", "noise_hi", "noise_lo"), np.float32)
    made |= {"column": np.int32, "row": np.int32}
    found = run_kernel(backend, with_header("fbm", KERNEL), depth.size, given, made)
    return {name: values.reshape(depth.shape) for name, values in found.items()}


def expected_places(eye: Camera, depth: np.ndarray, at: dict[str, Any]) -> np.ndarray:
    """By the definition, from the float32 arguments that every backend gets."""
    K = eye.K.astype(np.float32).astype(np.float64)
    arrays = {name: at[name].astype(np.float64) for name in ("to_world", "to_world_lo", "eye", "eye_lo")}
    return places(depth.astype(np.float64), fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2], **arrays)


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("yaw", [0.0, 1.0, np.pi / 2, -2.5])
def test_kernels_know_the_cell(opencl_backend: OpenCLBackend, origin: tuple[float, float, float], yaw: float) -> None:
    """Cells of 0.6 m up to 150 m away, to a millionth of a cell; places to a few billionths of a metre."""
    eye = camera(WIDTH, HEIGHT, pose(x=3.3, z=-80.0, yaw=yaw))
    depth = np.random.default_rng(1).uniform(0.5, 150, (HEIGHT, WIDTH)).astype(np.float32)
    found, at = look(opencl_backend, eye, depth, origin), anchor(eye, 0.0, origin)
    world = expected_places(eye, depth, at)
    assert np.abs(found["hi"].astype(np.float64) + found["lo"] - world[..., 0]).max() < 1e-9
    for axis, number, into in ((0, "column", "into"), (2, "row", "across")):
        cell, inside = cells_of(world[..., axis], at["block"][axis], CELLS)
        # A place at a border may fall on either side of it: cell + into is what must agree.
        off = (found[number] - cell) + (found[into].astype(np.float64) - inside)
        assert np.abs(off).max() < 1e-6
        assert found[into].min() >= 0
        assert found[into].max() <= 1


@pytest.mark.parametrize("origin", ORIGINS)
def test_kernels_know_the_noise(opencl_backend: OpenCLBackend, origin: tuple[float, float, float]) -> None:
    """A thousand times better than a float: shores are made of small differences."""
    eye = camera(WIDTH, HEIGHT, pose(x=3.3, z=-80.0))
    depth = np.random.default_rng(1).uniform(0.5, 150, (HEIGHT, WIDTH)).astype(np.float32)
    found, at = look(opencl_backend, eye, depth, origin), anchor(eye, 0.0, origin)
    world = expected_places(eye, depth, at)
    noise = fbm(world[..., 0], world[..., 2], block=at["block"], cells=16, weight=WEIGHT.astype(np.float64), seed=5)
    assert np.abs(found["noise_hi"].astype(np.float64) + found["noise_lo"] - noise).max() < 1e-10


@pytest.mark.parametrize("origin", ORIGINS)
def test_the_reference_is_where_the_pose_says(origin: tuple[float, float, float]) -> None:
    eye = camera(WIDTH, HEIGHT, pose(x=-161.0, z=479.5, yaw=2.0))
    depth = np.random.default_rng(2).uniform(0.5, 150, (HEIGHT, WIDTH))
    at = anchor(eye, 0.0, origin)
    R, place = eye.camera_to_world[:3, :3], eye.camera_to_world[:3, 3] + np.array(origin)
    K = eye.K.astype(np.float32)
    v, u = np.indices(depth.shape)
    point = np.stack(
        [(u - K[0, 2].astype(float)) / K[0, 0], (v - K[1, 2].astype(float)) / K[1, 1], np.ones(depth.shape)], axis=-1
    )
    expected = (point * depth[..., None]) @ R.T + place
    found = expected_places(eye, depth, at) + at["block"].astype(np.float64) * BLOCK
    assert np.abs(found - expected).max() < 1e-8


def test_cells_count_on_below_zero() -> None:
    """Floor, not truncation; a cell's number does not depend on the block from which it is counted."""
    place = np.array([-160.0, -0.5, -1e-9, 0.0, 0.5, 159.999, 160.0])
    cell, into = cells_of(place, 0, 160)
    assert np.array_equal(cell, [-160, -1, -1, 0, 0, 159, 160])
    assert np.allclose(cell + into, place)
    assert (into >= 0).all()
    for block in (-26_000, -1, 3, 26_000):
        other, inside = cells_of(place, block, 160)
        assert np.array_equal(other - 160 * block, cell)
        assert np.array_equal(inside, into)


def test_an_origin_far_away_moves_no_cell() -> None:
    """The same camera told as pose and origin in two ways."""
    for shift in ((0.0, 0.0, 0.0), (4e6, 0.0, -4e6), (123.25, 7.5, -80.5)):
        here, there = pose(), pose()
        there[:3, 3] -= shift
        a = anchor(camera(8, 8, here), 1.0)
        b = anchor(camera(8, 8, there), 1.0, shift)
        for name in a:
            assert np.allclose(a[name], b[name], atol=1e-9), name


@pytest.mark.parametrize(("time", "tick"), [(0.0, 0), (1.5, 6144), (1e6, 4_096_000_000 - 2**32), (-1.0, -4096)])
def test_time_wraps_as_an_integer(time: float, tick: int) -> None:
    assert anchor(camera(8, 8), time)["tick"] == tick
    assert anchor(camera(8, 8), time + 2**32 / TICKS)["tick"] == tick
