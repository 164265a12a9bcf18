"""The local lights' arithmetic in PyTorch, float32: a peer for the bench of the kernel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from aw4d.gbuffer import GBuffer
from aw4d.lights.light import LightArrays
from aw4d.passes import PASSES


def _unit(x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    inv = torch.rsqrt((x * x + y * y + z * z).clamp(min=1e-30))
    return x * inv, y * inv, z * inv


def spot_lights(planes: dict[str, Any], camera: tuple[float, ...], lights: list[dict[str, Any]]) -> Any:
    """Radiance (3, H, W) that spots send to the eye: the physical form, in the algebra of cl/spot_lights.cl."""
    fx, fy, cx, cy = camera
    height, width = planes["depth"].shape
    kx = ((torch.arange(width, dtype=torch.float32) - cx) / fx)[None, :]
    ky = ((torch.arange(height, dtype=torch.float32) - cy) / fy)[:, None]
    z = planes["depth"]
    x, y = kx * z, ky * z
    inv = -torch.rsqrt(kx * kx + ky * ky + 1)
    vx, vy, vz = kx * inv, ky * inv, inv
    nx, ny, nz = _unit(*planes["normal"])
    nov = nx * vx + ny * vy + nz * vz
    tx, ty, tz = vx - nov * nx, vy - nov * ny, vz - nov * nz
    NoV = nov.clamp(1e-4, 1)
    a2 = planes["roughness"].clamp(min=0.045) ** 4
    grow, rest = NoV * NoV * (1 - a2), NoV * NoV * a2
    root = torch.sqrt(grow + a2)
    t = ((planes["roughness"] - 0.32) / 0.42).clamp(0, 1)
    share = (0.04 + (1.0 - 0.918 * t * t * (3 - 2 * t)) * (1 - NoV) ** 5).clamp(max=1)
    surface = (~planes["sky"]).float()
    metal = planes["metallic"]
    albedo = planes["albedo"].clamp(0, 1)
    f0 = 0.04 + (albedo - 0.04) * metal
    pigment = albedo * ((1 - metal) / torch.pi * (1 - share) * surface)
    scale = a2 * surface * (0.5 / torch.pi)
    out = planes["emissive"].clone()
    for light in lights:
        (lx, ly, lz), (dx, dy, dz) = light["position"], light["direction"]
        px, py, pz = lx - x, ly - y, lz - z
        d2 = px * px + py * py + pz * pz
        inv_d = torch.rsqrt(d2.clamp(min=1e-18))
        cos = -(px * dx + py * dy + pz * dz) * inv_d
        cone = ((cos - light["cos_outer"]) * light["inv_cone"]).clamp(0, 1)
        reach = (1 - (d2 * light["inv_reach2"]) ** 2).clamp(min=0)
        nop = nx * px + ny * py + nz * pz
        NoL = nop.clamp(min=0) * inv_d
        weight = (cone * reach) ** 2 * NoL / (d2 + 1e-4)
        qx, qy, qz = ((p - nop * n) * inv_d + t for p, n, t in ((px, nx, tx), (py, ny, ty), (pz, nz, tz)))
        T2 = qx * qx + qy * qy + qz * qz + 1e-13
        noh2 = (nov + nop * inv_d) ** 2
        H2, den = T2 + noh2, T2 + a2 * noh2
        DV = scale * H2 * H2 / (den * den * (NoL * root + torch.sqrt(NoL * NoL * grow + rest)))
        m = (1 - 0.5 * torch.sqrt(H2)).clamp(min=0)
        schlick = (m * m) ** 2 * m
        out = out + (pigment + DV * (f0 + (1 - f0) * schlick)) * weight * light["intensity"]
    return out


def prepared(source: GBuffer, lights: LightArrays) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    """The function and its arguments; the lights' numbers are constants that a compiler may fold."""
    planes = {}
    for name in PASSES["spot_lights"].reads:
        values = source[name] if source[name].ndim == 2 else np.moveaxis(source[name], -1, 0)
        planes[name] = torch.from_numpy(np.ascontiguousarray(values))
    K = source.camera.K
    shining = [
        {
            "position": lights.light_position[i].tolist(),
            "direction": lights.light_direction[i].tolist(),
            "cos_outer": float(lights.light_cos_outer[i]),
            "inv_cone": 1 / float(lights.light_cos_inner[i] - lights.light_cos_outer[i]),
            "inv_reach2": float(lights.light_r_max[i]) ** -2,
            "intensity": torch.from_numpy(lights.light_intensity[i].reshape(3, 1, 1).copy()),
        }
        for i in range(len(lights))
    ]
    return spot_lights, (planes, (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), shining)
