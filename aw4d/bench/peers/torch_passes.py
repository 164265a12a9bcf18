"""Some passes in PyTorch, float32, in the kernels' algebra: eager and compiled."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import torch

from aw4d.bench.peers.given import Given

LUMINANCE = (0.2126, 0.7152, 0.0722)


def _unit(x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    inv = torch.rsqrt((x * x + y * y + z * z).clamp(min=1e-30))
    return x * inv, y * inv, z * inv


def _slopes(shape: Any, camera: tuple[float, ...]) -> tuple[Any, Any]:
    """x / z of every column and y / z of every row."""
    fx, fy, cx, cy = camera
    kx = ((torch.arange(shape[1], dtype=torch.float32) - cx) / fx)[None, :]
    ky = ((torch.arange(shape[0], dtype=torch.float32) - cy) / fy)[:, None]
    return kx, ky


def _colour(values: Any) -> Any:
    return torch.tensor(values, dtype=torch.float32).reshape(3, 1, 1)


def spot_lights(planes: dict[str, Any], camera: tuple[float, ...], lights: Any, p: Any) -> Any:
    """Radiance (3, H, W) that spots send to the eye."""
    kx, ky = _slopes(planes["depth"].shape, camera)
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
        lx, ly, lz, dx, dy, dz, cos_outer, inv_cone, r_max = light[:9]
        px, py, pz = lx - x, ly - y, lz - z
        d2 = px * px + py * py + pz * pz
        inv_d = torch.rsqrt(d2.clamp(min=1e-18))
        cos = -(px * dx + py * dy + pz * dz) * inv_d
        cone = ((cos - cos_outer) * inv_cone).clamp(0, 1)
        reach = (1 - (d2 / (r_max * r_max)) ** 2).clamp(min=0)
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
        out = out + (pigment + DV * (f0 + (1 - f0) * schlick)) * weight * light[9:].reshape(3, 1, 1)
    return out


def fog(planes: dict[str, Any], camera: tuple[float, ...], lights: Any, p: dict[str, Any]) -> Any:
    """Single scattering of spots and the air's own light: one function for the air, one for each light."""
    out, ray, s = p["air"](planes, camera, p)
    for light in lights:
        out = p["light"](out, light, ray, s, p)
    return out


def _air(planes: dict[str, Any], camera: tuple[float, ...], p: dict[str, Any]) -> Any:
    """Surfaces through the fog and its own light, and the rays with their lengths."""
    kx, ky = _slopes(planes["depth"].shape, camera)
    stretch = torch.sqrt(kx * kx + ky * ky + 1)
    z = 1 / stretch
    s = torch.where(planes["sky"], p["extent_m"], (planes["depth"] * stretch).clamp(max=p["extent_m"]))
    T = torch.exp(-p["extinction"] * s)
    air = (1 - T) * (p["scattering"] / p["extinction"] * _colour(p["color"]))
    return planes["rgb"] * T + air, (kx * z, ky * z, z), s


def _light(out: Any, light: Any, ray: tuple[Any, Any, Any], s: Any, p: dict[str, Any]) -> Any:
    """The glow of a spot added: quadrature along every ray, node after node."""
    x, y, z = ray
    px, py, pz, dx, dy, dz, cos_outer, inv_cone, r_max = light[:9]
    t0 = x * px + y * py + z * pz
    ax, ay, az = py * z - pz * y, pz * x - px * z, px * y - py * x
    D2 = ax * ax + ay * ay + az * az + 1e-4
    inv_D = torch.rsqrt(D2)
    D = D2 * inv_D
    c = x * dx + y * dy + z * dz
    k = -((y * az - z * ay) * dx + (z * ax - x * az) * dy + (x * ay - y * ax) * dz) * inv_D
    reach = torch.sqrt((r_max * r_max - D2).clamp(min=0))
    R = torch.sqrt(c * c + k * k)
    middle = torch.atan2(k, -c)
    middle = torch.where(middle < -torch.pi / 2, middle + 2 * torch.pi, middle)
    half = torch.acos((cos_outer / torch.maximum(R, cos_outer)).clamp(-1, 1))
    low = torch.maximum(torch.atan2(D, torch.minimum(t0, reach)), middle - half)
    high = torch.minimum(torch.atan2(D, torch.maximum(t0 - s, -reach)), middle + half)
    high = torch.maximum(low, high)
    g = p["g"]
    stretched = ((1 + g) / (1 - g)) ** 2
    ends = [(torch.cos(0.5 * a), torch.sin(0.5 * a)) for a in (low, high)]
    by = [torch.rsqrt(c * c + stretched * s * s) for c, s in ends]
    (c0, s0), (c1, s1) = [(c * b, s * b) for (c, s), b in zip(ends, by, strict=True)]
    turn = torch.where(r_max > D, torch.sin(0.5 * (high - low)) * by[0] * by[1], 0)
    total = torch.zeros_like(D)
    for node, weight in zip(*p["quadrature"], strict=True):
        at = 0.5 + 0.5 * node
        cos, sin = c0 + at * (c1 - c0), s0 + at * (s1 - s0)  # along half the scattering angle, of length sqrt(N)
        sc, s2, c2 = sin * cos, sin * sin, cos * cos
        N = s2 + c2
        inv = 1 / sc.clamp(min=1e-9)
        inside = (((k * 2 * sc - c * (c2 - s2)) / N - cos_outer) * inv_cone).clamp(0, 1)
        window = (1 - (0.5 * D * N * inv / r_max) ** 4).clamp(min=0)
        NQ = N * (c2 + stretched * s2)
        path = torch.exp(-p["extinction"] * (t0 + D * s2 * inv))
        total = total + weight * (inside * window * N) ** 2 * path / (NQ * torch.sqrt(NQ))
    scale = p["gamma"] * p["scattering"] * (1 + g) / (4 * torch.pi * (1 - g) ** 2)
    return out + total * turn * inv_D * scale * light[9:].reshape(3, 1, 1)


def harmonize(planes: dict[str, Any], camera: Any, lights: Any, p: dict[str, Any]) -> Any:
    """Ambient light and that of the lamps."""
    direct = planes["direct"]
    mean = (direct[0] + direct[1] + direct[2]) * (1 / 3)
    weight = (p["strength"] * (mean - p["threshold"]).clamp(min=0)).clamp(0, 1)
    return (1 - weight) * planes["rgb"] + direct


def overcast_sky(planes: dict[str, Any], camera: Any, lights: Any, p: dict[str, Any]) -> Any:
    """The sky under clouds."""
    rgb = planes["rgb"]
    red, green, blue = LUMINANCE
    luminance = red * rgb[0] + green * rgb[1] + blue * rgb[2]
    tint = p["tint"]
    clouds = _colour([c / sum(a * b for a, b in zip(LUMINANCE, tint, strict=True)) for c in tint])
    grey = (1 - p["desaturation"]) * rgb + p["desaturation"] * luminance
    return torch.where(planes["sky"], (1 - p["amount"]) * grey + p["amount"] * luminance * clouds, rgb)


def wet_ground(planes: dict[str, Any], camera: tuple[float, ...], lights: Any, p: dict[str, Any]) -> Any:
    """Albedo, roughness and wetness of wet surfaces, no light lost in the water."""
    nx, ny, nz = _unit(*planes["normal"])
    ux, uy, uz = p["up"]
    rough, albedo = planes["roughness"], planes["albedo"]
    opened = 0.5 + 0.5 * (nx * ux + ny * uy + nz * uz)
    wet = torch.where(planes["sky"], 0, p["intensity"] * opened * opened * planes["snow_bare"])
    porous = ((rough - 0.5) * 2.5).clamp(0, 1) * (1 - planes["metallic"])
    share = wet * porous * p["porosity"]
    closed = torch.where(planes["road"], 1, p["film"])
    new = albedo + share * (albedo.clamp(max=p["water_albedo"]) - albedo)
    return new, rough + closed * wet * (rough.clamp(max=p["water_roughness"]) - rough), wet


FUNCTIONS = {
    "spot_lights": spot_lights,
    "fog": fog,
    "harmonize": harmonize,
    "overcast_sky": overcast_sky,
    "wet_ground": wet_ground,
}


def prepared(given: Given, *, compiled: bool) -> Callable[[], Any]:
    """A call of the pass, on as many threads as there are cores; it returns the plane that is compared, as NumPy's."""
    torch.set_num_threads(os.cpu_count() or 1)
    planes = {name: torch.from_numpy(values) for name, values in given.planes.items()}
    p = given.params.arguments()
    if given.step == "wet_ground":
        p["up"] = [float(value) for value in given.scene.world["up"]]
    lights = torch.from_numpy(given.light_table)
    run = FUNCTIONS[given.step]
    if given.step == "fog":
        scattering = p["alpha"] * p["sigma_s"]
        p |= {"scattering": scattering, "extinction": scattering + p["alpha"] * p["sigma_a"], "quadrature": given.nodes}
        p |= (
            {"air": torch.compile(_air), "light": torch.compile(_light)} if compiled else {"air": _air, "light": _light}
        )
    elif compiled:
        run = torch.compile(run)

    def call() -> Any:
        with torch.no_grad():
            out = run(planes, given.camera, lights, p)
        return (out[0] if isinstance(out, tuple) else out).numpy()

    return call
