"""Some passes in Numba, float32, parallel over rows: columns in the innermost loops, which LLVM vectorises.

A light's numbers lie in a row, as `Given.light_table` has them.
"""

# Numba finds the types of its functions by itself.
# mypy: allow-untyped-defs, no-check-untyped-defs

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba import njit, prange

from aw4d.bench.peers.given import Given

f32 = np.float32
ZERO, HALF, ONE, TWO = f32(0), f32(0.5), f32(1), f32(2)
PI = f32(math.pi)
EPSILON = f32(1e-4)  # [m^2] softening of 1/d^2
_jit = njit(parallel=True, fastmath=True, cache=False)


@njit(inline="always")
def _clamp(x, low, high):
    return min(max(x, low), high)


@_jit
def spot_lights(depth, normal, albedo, roughness, metallic, emissive, sky, camera, lights, out):
    """Radiance (3, H, W) that spots send to the eye: the physical form."""
    fx, fy, cx, cy = camera
    height, width = depth.shape
    for v in prange(height):
        row = np.empty((18, width), np.float32)
        ky = (f32(v) - cy) / fy
        for u in range(width):
            kx = (f32(u) - cx) / fx
            nx, ny, nz = normal[0, v, u], normal[1, v, u], normal[2, v, u]
            unit = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, f32(1e-30)))
            nx, ny, nz = nx * unit, ny * unit, nz * unit
            inv = -ONE / math.sqrt(kx * kx + ky * ky + ONE)
            vx, vy, vz = kx * inv, ky * inv, inv
            nov = nx * vx + ny * vy + nz * vz
            NoV = _clamp(nov, f32(1e-4), ONE)
            rough = max(roughness[v, u], f32(0.045))
            a2 = rough * rough * rough * rough
            t = _clamp((roughness[v, u] - f32(0.32)) / f32(0.42), ZERO, ONE)
            m = ONE - NoV
            m5 = m * m * m * m * m
            share = min(f32(0.04) + (ONE - f32(0.918) * t * t * (f32(3) - TWO * t)) * m5, ONE)
            surface = ZERO if sky[v, u] else ONE
            z = depth[v, u]
            row[0, u], row[1, u], row[2, u] = kx * z, ky * z, z
            row[3, u], row[4, u], row[5, u] = nx, ny, nz
            row[6, u], row[7, u], row[8, u] = vx - nov * nx, vy - nov * ny, vz - nov * nz
            row[9, u], row[10, u] = nov, a2
            row[11, u] = NoV * NoV * (ONE - a2)
            row[12, u] = math.sqrt(row[11, u] + a2)
            row[13, u] = NoV * NoV * a2
            row[14, u] = (ONE - metallic[v, u]) / PI * (ONE - share) * surface
            row[15, u] = a2 * surface * (HALF / PI)
            for c in range(3):
                out[c, v, u] = emissive[c, v, u]
        for i in range(lights.shape[0]):
            lx, ly, lz, dx, dy, dz = lights[i, 0], lights[i, 1], lights[i, 2], lights[i, 3], lights[i, 4], lights[i, 5]
            cos_outer, inv_cone, inv_reach2 = lights[i, 6], lights[i, 7], ONE / (lights[i, 8] * lights[i, 8])
            red, green, blue = lights[i, 9], lights[i, 10], lights[i, 11]
            for u in range(width):
                px, py, pz = lx - row[0, u], ly - row[1, u], lz - row[2, u]
                nx, ny, nz = row[3, u], row[4, u], row[5, u]
                d2 = px * px + py * py + pz * pz
                inv_d = ONE / math.sqrt(max(d2, f32(1e-18)))
                cosine = -(px * dx + py * dy + pz * dz) * inv_d
                cone = _clamp((cosine - cos_outer) * inv_cone, ZERO, ONE)
                q = d2 * inv_reach2
                reach = max(ONE - q * q, ZERO)
                nop = nx * px + ny * py + nz * pz
                NoL = max(nop, ZERO) * inv_d
                weight = cone * cone * reach * reach * NoL / (d2 + EPSILON)
                qx = (px - nop * nx) * inv_d + row[6, u]
                qy = (py - nop * ny) * inv_d + row[7, u]
                qz = (pz - nop * nz) * inv_d + row[8, u]
                T2 = qx * qx + qy * qy + qz * qz + f32(1e-13)
                noh = row[9, u] + nop * inv_d
                H2, den = T2 + noh * noh, T2 + row[10, u] * noh * noh
                lam = NoL * row[12, u] + math.sqrt(NoL * NoL * row[11, u] + row[13, u])
                DV = row[15, u] * H2 * H2 / (den * den * lam)
                m = max(ONE - HALF * math.sqrt(H2), ZERO)
                schlick = m * m * m * m * m
                row[16, u] = weight * (row[14, u])
                row[17, u] = weight * DV
                plain, lobe = row[16, u], row[17, u]
                metal = metallic[v, u]
                r, g, b = albedo[0, v, u], albedo[1, v, u], albedo[2, v, u]
                f = f32(0.04) + (r - f32(0.04)) * metal
                out[0, v, u] += (plain * r + lobe * (f + (ONE - f) * schlick)) * red
                f = f32(0.04) + (g - f32(0.04)) * metal
                out[1, v, u] += (plain * g + lobe * (f + (ONE - f) * schlick)) * green
                f = f32(0.04) + (b - f32(0.04)) * metal
                out[2, v, u] += (plain * b + lobe * (f + (ONE - f) * schlick)) * blue


@_jit
def fog(rgb, depth, sky, camera, lights, nodes, weights, medium, color, out):
    """Single scattering of spots and the air's own light."""
    fx, fy, cx, cy = camera
    scattering, extinction, g, gamma, extent = medium
    stretched = (ONE + g) * (ONE + g) / ((ONE - g) * (ONE - g))
    height, width = depth.shape
    for v in prange(height):
        row = np.empty((14, width), np.float32)
        ky = (f32(v) - cy) / fy
        for u in range(width):
            kx = (f32(u) - cx) / fx
            stretch = math.sqrt(kx * kx + ky * ky + ONE)
            s = extent if sky[v, u] else min(depth[v, u] * stretch, extent)
            T = math.exp(-extinction * s)
            row[0, u], row[1, u], row[2, u] = kx / stretch, ky / stretch, ONE / stretch
            row[3, u] = s
            for c in range(3):
                out[c, v, u] = T * rgb[c, v, u] + (ONE - T) * (scattering / extinction * color[c])
        for i in range(lights.shape[0]):
            px, py, pz, dx, dy, dz = lights[i, 0], lights[i, 1], lights[i, 2], lights[i, 3], lights[i, 4], lights[i, 5]
            cos_outer, inv_cone, r_max = lights[i, 6], lights[i, 7], lights[i, 8]
            for u in range(width):
                x, y, z, s = row[0, u], row[1, u], row[2, u], row[3, u]
                t0 = x * px + y * py + z * pz
                ax, ay, az = py * z - pz * y, pz * x - px * z, px * y - py * x
                D = math.sqrt(ax * ax + ay * ay + az * az + EPSILON)
                c = x * dx + y * dy + z * dz
                k = -((y * az - z * ay) * dx + (z * ax - x * az) * dy + (x * ay - y * ax) * dz) / D
                reach = math.sqrt(max(r_max * r_max - D * D, ZERO))
                R = math.sqrt(c * c + k * k)
                turned = math.atan2(k, -c)
                middle = turned + TWO * PI if turned < -HALF * PI else turned
                half = math.acos(_clamp(cos_outer / max(R, cos_outer), -ONE, ONE))
                low = max(math.atan2(D, min(t0, reach)), middle - half)
                high = max(min(math.atan2(D, max(t0 - s, -reach)), middle + half), low)
                c0, s0 = math.cos(HALF * low), math.sin(HALF * low)
                c1, s1 = math.cos(HALF * high), math.sin(HALF * high)
                by0 = ONE / math.sqrt(c0 * c0 + stretched * s0 * s0)
                by1 = ONE / math.sqrt(c1 * c1 + stretched * s1 * s1)
                row[4, u], row[5, u], row[6, u], row[7, u] = t0, D, c, k
                row[8, u], row[9, u] = HALF * (c1 * by1 + c0 * by0), HALF * (c1 * by1 - c0 * by0)
                row[10, u], row[11, u] = HALF * (s1 * by1 + s0 * by0), HALF * (s1 * by1 - s0 * by0)
                row[12, u] = math.sin(HALF * (high - low)) * by0 * by1 if r_max > D else ZERO
                row[13, u] = ZERO
            for j in range(nodes.shape[0]):
                at, w = nodes[j], weights[j]
                for u in range(width):
                    c, s = row[8, u] + at * row[9, u], row[10, u] + at * row[11, u]
                    sc, s2, c2 = s * c, s * s, c * c
                    N = s2 + c2
                    inv, D = ONE / max(sc, f32(1e-9)), row[5, u]
                    axial = (row[7, u] * TWO * sc - row[6, u] * (c2 - s2)) / N
                    cone = _clamp((axial - cos_outer) * inv_cone, ZERO, ONE)
                    r = HALF * D * N * inv / r_max
                    light = cone * max(ONE - r * r * r * r, ZERO) * N
                    NQ = N * (c2 + stretched * s2)
                    fade = math.exp(-extinction * (row[4, u] + D * s2 * inv))
                    row[13, u] += w * light * light * fade / (NQ * math.sqrt(NQ))
            scale = gamma * scattering * (ONE + g) / (f32(4) * PI * (ONE - g) * (ONE - g))
            red, green, blue = lights[i, 9] * scale, lights[i, 10] * scale, lights[i, 11] * scale
            for u in range(width):
                glow = row[13, u] * row[12, u] / row[5, u]
                out[0, v, u] += glow * red
                out[1, v, u] += glow * green
                out[2, v, u] += glow * blue


@_jit
def harmonize(rgb, direct, strength, threshold, out):
    """Ambient light and that of the lamps."""
    for v in prange(rgb.shape[1]):
        for u in range(rgb.shape[2]):
            mean = (direct[0, v, u] + direct[1, v, u] + direct[2, v, u]) * f32(1 / 3)
            keep = ONE - _clamp(strength * max(mean - threshold, ZERO), ZERO, ONE)
            out[0, v, u] = keep * rgb[0, v, u] + direct[0, v, u]
            out[1, v, u] = keep * rgb[1, v, u] + direct[1, v, u]
            out[2, v, u] = keep * rgb[2, v, u] + direct[2, v, u]


@_jit
def overcast_sky(rgb, sky, clouds, amount, desaturation, out):
    """The sky under clouds."""
    for v in prange(rgb.shape[1]):
        for u in range(rgb.shape[2]):
            r, g, b = rgb[0, v, u], rgb[1, v, u], rgb[2, v, u]
            luminance = f32(0.2126) * r + f32(0.7152) * g + f32(0.0722) * b
            share = (ONE - amount) * (ONE - desaturation) if sky[v, u] else ONE
            grey = (ONE - amount) * desaturation * luminance if sky[v, u] else ZERO
            cover = amount * luminance if sky[v, u] else ZERO
            out[0, v, u] = share * r + grey + cover * clouds[0]
            out[1, v, u] = share * g + grey + cover * clouds[1]
            out[2, v, u] = share * b + grey + cover * clouds[2]


@_jit
def wet_ground(albedo, roughness, metallic, normal, sky, road, snow_bare, up, p, out, out_roughness, wetness):
    """Albedo, roughness and wetness of wet surfaces, no light lost in the water."""
    intensity, porosity, water_albedo, water_roughness, film = p
    ux, uy, uz = up[0], up[1], up[2]
    for v in prange(roughness.shape[0]):
        for u in range(roughness.shape[1]):
            nx, ny, nz = normal[0, v, u], normal[1, v, u], normal[2, v, u]
            unit = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, f32(1e-30)))
            rough = roughness[v, u]
            opened = HALF + HALF * unit * (nx * ux + ny * uy + nz * uz)
            wet = ZERO if sky[v, u] else intensity * opened * opened * snow_bare[v, u]
            porous = _clamp((rough - HALF) * f32(2.5), ZERO, ONE) * (ONE - metallic[v, u])
            share = wet * porous * porosity
            closed = ONE if road[v, u] else film
            for c in range(3):
                dry = albedo[c, v, u]
                out[c, v, u] = dry + share * (min(dry, water_albedo) - dry)
            out_roughness[v, u] = rough + closed * wet * (min(rough, water_roughness) - rough)
            wetness[v, u] = wet


def _arguments(given: Given) -> tuple[Any, tuple[Any, ...]]:
    """The function and all that it takes but for where its result goes."""
    planes, p = given.planes, given.params.arguments()
    camera = tuple(map(f32, given.camera))
    if given.step == "spot_lights":
        names = ("depth", "normal", "albedo", "roughness", "metallic", "emissive", "sky")
        return spot_lights, (*(planes[name] for name in names), camera, given.light_table)
    if given.step == "fog":
        scattering, extinction = p["alpha"] * p["sigma_s"], p["alpha"] * (p["sigma_s"] + p["sigma_a"])
        medium = tuple(map(f32, (scattering, extinction, p["g"], p["gamma"], p["extent_m"])))
        tables = [np.array(values, np.float32) for values in (*given.nodes, p["color"])]
        lit = (*(planes[name] for name in ("rgb", "depth", "sky")), camera, given.light_table)
        return fog, (*lit, tables[0], tables[1], medium, tables[2])
    if given.step == "harmonize":
        return harmonize, (planes["rgb"], planes["direct"], f32(p["strength"]), f32(p["threshold"]))
    if given.step == "overcast_sky":
        tint = np.array(p["tint"])
        clouds = (tint / (tint @ (0.2126, 0.7152, 0.0722))).astype(np.float32)
        return overcast_sky, (planes["rgb"], planes["sky"], clouds, f32(p["amount"]), f32(p["desaturation"]))
    names = ("albedo", "roughness", "metallic", "normal", "sky", "road", "snow_bare")
    numbers = tuple(f32(p[key]) for key in ("intensity", "porosity", "water_albedo", "water_roughness", "film"))
    return wet_ground, (*(planes[name] for name in names), np.asarray(given.scene.world["up"], np.float32), numbers)


def prepared(given: Given) -> Callable[[], Any]:
    """A call of the pass, on as many threads as there are cores; it returns the plane that is compared."""
    numba.set_num_threads(min(os.cpu_count() or 1, numba.config.NUMBA_NUM_THREADS))
    function, arguments = _arguments(given)
    shape = given.frame.camera.shape
    out = np.empty((3, *shape), np.float32)
    more = (np.empty(shape, np.float32), np.empty(shape, np.float32)) if given.step == "wet_ground" else ()

    def call() -> Any:
        function(*arguments, out, *more)
        return out

    return call
