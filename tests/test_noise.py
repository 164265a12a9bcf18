"""Noise of the world: the same bits everywhere, evenly spread, smooth across cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from reference_numpy.noise import halves, hash2, unit, value_noise
from tests.device_code import run_kernel, with_header

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

FAR = [-(2**31), -26_250_000, -1, 0, 1, 26_250_000, 2**31 - 1]
HASHES = """
__kernel void hashes(__global const int *x, __global const int *z, const uint seed,
                     __global int *bits, __global float *whole, __global float *low, __global float *high)
{
    const int i = get_global_id(0) * W;
    const uintw h = hash2(LOADW(x + i), hash_row(LOADW(z + i), seed));
    STOREW(as_intw(h), bits + i);
    STOREW(unit(h), whole + i);
    STOREW(low_half(h), low + i);
    STOREW(high_half(h), high + i);
}
"""
NOISE = """
__kernel void noise(__global const int *x, __global const int *z, __global const float *u, __global const float *w,
                    const uint seed, __global float *out)
{
    const int i = get_global_id(0) * W;
    STOREW(value_noise(LOADW(x + i), LOADW(z + i), LOADW(u + i), LOADW(w + i), seed), out + i);
}
"""


def cells(count: int = 4096) -> tuple[np.ndarray, np.ndarray]:
    """Cells anywhere, and the pairs of some far and near ones."""
    x, z = np.random.default_rng(5).integers(-(2**31), 2**31, (2, count))
    pairs = np.array(np.meshgrid(FAR, FAR)).reshape(2, -1)
    x[: pairs.shape[1]], z[: pairs.shape[1]] = pairs
    return x, z


@pytest.mark.parametrize("seed", [0, 7, 2**31 - 1])
def test_kernels_hash_to_the_same_bits(opencl_backend: OpenCLBackend, seed: int) -> None:
    x, z = cells()
    given = {"x": x.astype(np.int32), "z": z.astype(np.int32), "seed": np.uint32(seed)}
    made = {"bits": np.int32, "whole": np.float32, "low": np.float32, "high": np.float32}
    found = run_kernel(opencl_backend, with_header("noise", HASHES), len(x), given, made)
    expected = hash2(x, z, seed)
    assert np.array_equal(found["bits"].view(np.uint32), expected)
    assert np.array_equal(found["whole"], unit(expected))
    assert np.array_equal([found["low"], found["high"]], halves(expected))


@pytest.mark.parametrize("seed", [0, 7, 2**31 - 1])
def test_kernels_have_the_same_noise(opencl_backend: OpenCLBackend, seed: int) -> None:
    x, z = cells()
    u, w = np.random.default_rng(6).random((2, len(x)), dtype=np.float32)
    u[:4], w[:4] = (0, 1, 0, 1), (0, 0, 1, 1)
    given = {"x": x.astype(np.int32), "z": z.astype(np.int32), "u": u, "w": w, "seed": np.uint32(seed)}
    found = run_kernel(opencl_backend, with_header("noise", NOISE), len(x), given, {"out": np.float32})["out"]
    expected = value_noise(x, z, u.astype(np.float64), w.astype(np.float64), seed)
    assert np.abs(found - expected).max() < 1.5e-7


@pytest.mark.parametrize("bit", range(32))
def test_every_bit_of_a_cell_counts(bit: int) -> None:
    """Cells whose numbers differ in one bit have unrelated hashes: half of the bits differ."""
    x, z = cells()
    for other in (hash2(x ^ (1 << bit), z, 3), hash2(x, z ^ (1 << bit), 3), hash2(x, z, 3 ^ (1 << (bit % 31)))):
        differ = np.bitwise_count(hash2(x, z, 3) ^ other).mean()
        assert differ == pytest.approx(16, abs=5 * np.sqrt(8 / len(x)))


def test_bits_are_evenly_spread() -> None:
    h = hash2(*np.meshgrid(np.arange(-128, 128), np.arange(-128, 128)), 3).ravel()
    bits = (h[:, None] >> np.arange(32, dtype=np.uint32)) & 1
    assert np.abs(bits.mean(axis=0) - 0.5).max() < 4.5 * 0.5 / np.sqrt(len(h))
    between = np.corrcoef(bits.T)[~np.eye(32, dtype=bool)]
    assert np.abs(between).max() < 5 / np.sqrt(len(h))


def test_numbers_are_evenly_spread() -> None:
    h = hash2(*np.meshgrid(np.arange(256), np.arange(256)), 4).ravel()
    for values in (unit(h), *halves(h)):
        assert values.min() >= 0
        assert values.max() < 1
        count, _ = np.histogram(values, bins=64, range=(0, 1))
        expected = len(h) / 64
        assert ((count - expected) ** 2 / expected).sum() < 63 + 5 * np.sqrt(2 * 63)


def test_noise_is_within_bounds_and_takes_the_corners_values() -> None:
    x, z = cells()
    u, w = np.random.default_rng(7).random((2, len(x)))
    values = value_noise(x, z, u, w, 9)
    assert values.min() >= 0
    assert values.max() <= 1
    for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)):
        at = value_noise(x, z, np.full(len(x), float(i)), np.full(len(x), float(j)), 9)
        assert np.allclose(at, unit(hash2(x + i, z + j, 9)), atol=1e-15)


def test_noise_goes_on_across_cells() -> None:
    """Value and slope: from the last of one cell to the first of the next."""
    x, z = cells()
    along, none, step = np.random.default_rng(8).random(len(x)), np.zeros(len(x)), 1e-6
    for last, following in (
        ((x, z, none + 1, along), (x + 1, z, none, along)),
        ((x, z, along, none + 1), (x, z + 1, along, none)),
    ):
        assert np.allclose(value_noise(*last, 9), value_noise(*following, 9), atol=1e-15)
    rise = value_noise(x + 1, z, none + step, along, 9) - value_noise(x, z, none + 1 - step, along, 9)
    assert np.abs(rise).max() < 1e-3 * step  # flat at the border
