"""In-scatter of the fog against a path tracer limited to one scattering event (Mitsuba 3, volpath, max_depth 2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from reference_numpy.fog import fog
from reference_numpy.lamp import POINT, SPOT

mi = pytest.importorskip("mitsuba", reason="mitsuba is not installed (pip install mitsuba)")

WIDTH, HEIGHT = 8, 6
FOV_DEG = 50.0  # along x
WALL_M = 30.0
LAMP = (-5.5, -1.0, 9.0)  # camera frame; just outside the picture: in it, the 1/r^2 gives the tracer infinite variance
AXIS = np.array([1.0, 0.3, 0.2]) / np.linalg.norm([1.0, 0.3, 0.2])
OUTER_DEG, INNER_DEG = 35.0, 34.99  # a hard edge: Mitsuba's falloff inside the edge is another function
INTENSITY = 50.0
SUB = 24  # our rays per pixel and axis, to average over the pixel as the path tracer does
RENDERS, SAMPLES = 8, {POINT: 16384, SPOT: 32768}


def _path_traced(kind: int, sigma_t: float, albedo: float, g: float) -> NDArray[np.float64]:
    """Independent renders of the glow, (RENDERS, HEIGHT, WIDTH)."""
    # Mitsuba's camera looks along +z with x to the left and y up: our axes are (-x, -y, z).
    position = [-LAMP[0], -LAMP[1], LAMP[2]]
    axis = [-AXIS[0], -AXIS[1], AXIS[2]]
    target = [p + a for p, a in zip(position, axis, strict=True)]
    spot = {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(origin=position, target=target, up=[0, 0, 1]),
        "intensity": {"type": "rgb", "value": INTENSITY},
        "cutoff_angle": OUTER_DEG,
        "beam_width": INNER_DEG,
    }
    point = {"type": "point", "position": position, "intensity": {"type": "rgb", "value": INTENSITY}}
    scene: Any = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": 2, "rr_depth": 1000},
            "fog": {
                "type": "homogeneous",
                "sigma_t": sigma_t,
                "albedo": albedo,
                "phase": {"type": "hg", "g": g},
            },
            "air": {
                "type": "cube",
                "to_world": mi.ScalarTransform4f().scale(200.0),
                "bsdf": {"type": "null"},
                "interior": {"type": "ref", "id": "fog"},
            },
            "wall": {
                "type": "rectangle",
                "to_world": mi.ScalarTransform4f().translate([0, 0, WALL_M]).rotate([0, 1, 0], 180).scale(100.0),
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
                "interior": {"type": "ref", "id": "fog"},
                "exterior": {"type": "ref", "id": "fog"},
            },
            "lamp": {**(spot if kind == SPOT else point), "medium": {"type": "ref", "id": "fog"}},
            "sensor": {
                "type": "perspective",
                "fov": FOV_DEG,
                "fov_axis": "x",
                "near_clip": 1e-3,
                "film": {
                    "type": "hdrfilm",
                    "width": WIDTH,
                    "height": HEIGHT,
                    "rfilter": {"type": "box"},
                    "pixel_format": "luminance",
                },
                "sampler": {"type": "independent", "sample_count": SAMPLES[kind]},
                "medium": {"type": "ref", "id": "fog"},
            },
        }
    )
    images = [np.array(mi.render(scene, seed=seed), dtype=np.float64) for seed in range(RENDERS)]
    return np.stack(images).reshape(RENDERS, HEIGHT, WIDTH)


def _ours(kind: int, sigma_t: float, albedo: float, g: float) -> NDArray[np.float64]:
    """The reference's in-scatter, averaged over each pixel, (HEIGHT, WIDTH)."""
    shape = (HEIGHT * SUB, WIDTH * SUB)
    focal = SUB * WIDTH / 2 / np.tan(np.radians(FOV_DEG / 2))
    out = fog(
        rgb=np.zeros((*shape, 3)),
        depth=np.full(shape, WALL_M),
        sky=np.zeros(shape, dtype=bool),
        fx=focal,
        fy=focal,
        cx=(shape[1] - 1) / 2,
        cy=(shape[0] - 1) / 2,
        light_kind=np.array([kind]),
        light_position=np.array([LAMP]),
        light_direction=AXIS[None],
        light_intensity=np.full((1, 3), INTENSITY),
        light_cos_inner=np.cos(np.radians([INNER_DEG])),
        light_cos_outer=np.cos(np.radians([OUTER_DEG])),
        light_r_max=np.array([1e6]),
        light_air_floor=np.zeros(1),
        sigma_s=sigma_t * albedo,
        sigma_a=sigma_t * (1 - albedo),
        alpha=1.0,
        g=g,
        gamma=1.0,
        beta=0.0,
        color=(0.0, 0.0, 0.0),
        nodes=32,
        extent_m=1e5,
        convention="physical",
    )
    return out["in_scatter"][..., 0].reshape(HEIGHT, SUB, WIDTH, SUB).mean(axis=(1, 3))


@pytest.mark.parametrize("g", [0.0, 0.8])
@pytest.mark.parametrize("sigma_t", [0.01, 0.03, 0.1])
@pytest.mark.parametrize("kind", [POINT, SPOT], ids=["point", "spot"])
def test_in_scatter_agrees_with_a_path_tracer(kind: int, sigma_t: float, g: float) -> None:
    mi.set_variant("scalar_rgb")
    renders = _path_traced(kind, sigma_t, 0.9, g)
    traced = renders.mean(axis=0)
    noise = renders.std(axis=0, ddof=1) / np.sqrt(RENDERS)
    ours = _ours(kind, sigma_t, 0.9, g)
    assert np.isfinite(ours).all()
    lit = traced > 0.05 * traced.max()
    assert np.count_nonzero(lit) >= 6
    # The whole picture has little noise, a pixel some: both must be within 1 % beyond it.
    total, total_noise = traced.sum(), renders.sum(axis=(1, 2)).std(ddof=1) / np.sqrt(RENDERS)
    assert total_noise < 0.01 * total
    assert abs(ours.sum() - total) <= 0.01 * total + 3 * total_noise
    # 4 standard errors: with 8 renders and some 500 pixels, 3 would fail by chance
    assert (np.abs(ours - traced)[lit] <= 0.01 * traced[lit] + 4 * noise[lit]).all()
