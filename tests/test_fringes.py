"""Albedo without fringes: nothing of the sky in a crown, nothing of the wall on a car; signs and walls as they were."""

from __future__ import annotations

import numpy as np

from aw4d.extract.fringes import without_fringes

H, W = 200, 320
SKY, LEAF = np.array((0.4, 0.6, 0.95), np.float32), np.array((0.06, 0.10, 0.03), np.float32)
NONE = np.zeros((H, W), dtype=np.bool_)


def crown() -> dict:
    """A leafy crown before a blue sky, its rim and holes in it mixed with sky and not in the mask of the sky."""
    sky = NONE.copy()
    sky[:60] = True
    picture = np.where(sky[..., None], SKY, LEAF).astype(np.float32)
    picture *= np.exp(np.random.default_rng(0).normal(0, 0.1, (H, W, 1))).astype(np.float32)
    picture[60] = 0.7 * SKY + 0.3 * LEAF
    picture[61] = 0.3 * SKY + 0.7 * LEAF
    for row, column in ((80, 50), (90, 150), (110, 250)):
        picture[row : row + 6, column : column + 7] = 0.8 * SKY + 0.2 * LEAF
    albedo = np.where(sky[..., None], 0, np.clip(2 * picture, 0.02, 0.9)).astype(np.float32)
    depth = np.full((H, W), 20, np.float32)
    return {"albedo": albedo, "rgb_linear": picture, "depth": depth, "sky": sky, "guessed": ~sky}


def test_no_pixel_of_a_crown_looks_like_sky() -> None:
    scene = crown()
    clean = without_fringes(**scene)
    leaves = clean[~scene["sky"]]
    assert (leaves[:, 2] < leaves[:, 1]).all()
    assert leaves[:, 2].max() < 0.2
    assert (scene["albedo"][~scene["sky"]][:, 2] > 0.9 * 2 * 0.3 * SKY[2]).any()  # there was something to do
    assert np.array_equal(clean[:60], scene["albedo"][:60])


def test_a_white_sign_far_from_the_sky_and_a_railing_stay() -> None:
    scene = crown()
    scene["rgb_linear"][150:162, 100:120] = 0.9
    scene["rgb_linear"][180:183, 40:240] = 0.6 * SKY
    for rows, columns in ((slice(150, 162), slice(100, 120)), (slice(180, 183), slice(40, 240))):
        scene["albedo"][rows, columns] = 0.6
        np.testing.assert_array_equal(without_fringes(**scene)[rows, columns], scene["albedo"][rows, columns])


def test_the_rim_of_a_car_before_a_white_wall_takes_the_cars_colour() -> None:
    """Depth says car where the picture still shows the wall, and the other way round."""
    depth = np.full((H, W), 20, np.float32)
    depth[60:140, 100:200] = 8
    albedo = np.full((H, W, 3), 0.8, np.float32)
    albedo[61:139, 101:199] = 0.04
    albedo[100, 200] = 0.04
    scene = {"rgb_linear": albedo, "depth": depth, "sky": NONE, "guessed": NONE}
    clean = without_fringes(albedo, **scene)
    assert clean[60:140, 100:200].max() < 0.1
    wall = np.ones((H, W), np.bool_)
    wall[60:140, 100:200] = False
    assert clean[wall].min() > 0.7


def test_paint_beside_a_step_that_is_no_mixture_stays() -> None:
    depth = np.full((H, W), 20, np.float32)
    depth[:, 100:] = 8
    albedo = np.full((H, W, 3), 0.2, np.float32)
    albedo[:, 100:] = (0.5, 0.1, 0.1)
    clean = without_fringes(albedo, rgb_linear=albedo, depth=depth, sky=NONE, guessed=NONE)
    np.testing.assert_allclose(clean, albedo, atol=1e-6)
