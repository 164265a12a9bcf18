"""Outlines of vehicles: moved to where the picture has them, in mask and depth alike."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from aw4d.extract.borders import settle_outlines

H, W = 80, 120
NONE = np.zeros((H, W), dtype=np.bool_)


def scene(off: int) -> dict:
    """A dark car at 10 m before a white wall at 20 m; mask and depth lie `off` pixels outside its outline."""
    car, found = NONE.copy(), NONE.copy()
    car[25:60, 40:80] = True
    found[25 - off : 60 + off, 40 - off : 80 + off] = True
    rgb = np.where(car[..., None], 30, 230).astype(np.uint8) * np.ones(3, np.uint8)
    depth = np.where(found, 10, 20).astype(np.float32)
    return {"car": car, "rgb": rgb, "depth": depth, "vehicle": 7 * found.astype(np.int32)}


def settle(s: dict, sky: np.ndarray = NONE) -> tuple[np.ndarray, np.ndarray]:
    level = np.zeros((H, W))
    return settle_outlines(s["depth"], s["vehicle"], rgb=s["rgb"], ground=level, sky=sky, focal=720.0)


CORNERS = 4  # neighbours decide together, so that a corner is rounded


def test_the_outline_moves_to_the_edge_in_the_picture() -> None:
    """To within a pixel, which the picture mixes."""
    for off in (-2, 2, 3):
        s = scene(off)
        depth, vehicle = settle(s)
        assert not (vehicle > 0)[~binary_dilation(s["car"])].any()
        assert (vehicle > 0)[24 + 2 : 61 - 2, 39 + 2 : 81 - 2].all()
        wall = (vehicle == 0) & (np.abs(depth - 20) > 0.1)
        assert np.count_nonzero(wall) == 0  # no wall at the car's depth
        assert np.count_nonzero((vehicle > 0) & (np.abs(depth - 10) > 0.1)) == 0


def test_an_outline_that_fits_and_one_without_contrast_stay() -> None:
    s = scene(0)
    depth, vehicle = settle(s)
    assert np.count_nonzero(vehicle != s["vehicle"]) <= CORNERS
    assert np.count_nonzero(depth != s["depth"]) <= CORNERS
    s = scene(2)
    s["rgb"][:] = 128
    assert np.count_nonzero(settle(s)[1] != s["vehicle"]) <= CORNERS


def test_sky_stays_and_input_is_not_written() -> None:
    s = scene(2)
    sky = NONE.copy()
    sky[:25] = True
    s["vehicle"][sky] = 0
    before = {name: values.copy() for name, values in s.items()}
    depth, vehicle = settle(s, sky)
    assert not vehicle[sky].any()
    assert np.array_equal(depth[sky], s["depth"][sky])
    for name, values in before.items():
        assert np.array_equal(values, s[name])
