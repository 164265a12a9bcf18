"""Vehicles are solid: what is seen through them does not enter their depth."""

from __future__ import annotations

import numpy as np

from aw4d.extract.solid import solid_depth


def test_a_window_takes_the_depth_of_the_car_around_it() -> None:
    depth = np.full((20, 30), 40.0, dtype=np.float32)
    vehicle = np.zeros((20, 30), dtype=np.int32)
    vehicle[5:15, 5:25] = 3
    depth[5:15, 5:25] = np.linspace(8, 11, 20, dtype=np.float32)
    holed = depth.copy()
    holed[7:10, 10:20] = 40
    closed = solid_depth(holed, vehicle)
    assert np.abs(closed - depth).max() < 1.0
    assert np.array_equal(closed[vehicle == 0], holed[vehicle == 0])


def test_a_few_stray_returns_do_not_dent_a_car() -> None:
    depth = np.full((40, 60), 30.0, dtype=np.float32)
    vehicle = np.zeros((40, 60), dtype=np.int32)
    vehicle[5:35, 5:55] = 3
    depth[5:35, 5:55] = np.linspace(8, 10, 50, dtype=np.float32)
    strays = depth.copy()
    strays[15:19, 20:24], strays[25:28, 40:46] = 11.5, 7.0
    closed = solid_depth(strays, vehicle)
    assert np.abs(closed - depth)[vehicle > 0].max() < 0.4
    assert np.abs(np.diff(closed[5:35, 5:55], axis=0)).max() < 0.1


def test_nothing_else_changes() -> None:
    depth = np.random.default_rng(0).uniform(5, 9, (12, 13)).astype(np.float32)
    assert np.array_equal(solid_depth(depth, np.zeros((12, 13), dtype=np.int32)), depth)


def test_a_flat_vehicle_stays_flat() -> None:
    depth = np.full((12, 13), 7.0, dtype=np.float32)
    np.testing.assert_allclose(solid_depth(depth, np.ones((12, 13), dtype=np.int32)), depth, rtol=1e-6)
