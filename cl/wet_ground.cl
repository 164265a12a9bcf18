/* wet_ground.cl - wet surfaces. Mirrors reference_numpy/wet_ground.py. Paper, supp. "Wet ground implementation". */
#include "include/exp.h"
#include "include/vec.h"

#define PAPER 1 /* convention */

/* (1 + n.up) / 2 of unit vectors, by the way from n to the nearer one of up and down: cosines near -1 or 1 have few digits. */
static inline floatw open_to_the_sky(
    const floatw nx, const floatw ny, const floatw nz, const float ux, const float uy, const float uz)
{
    const intw below = fma(nx, ux, fma(ny, uy, nz * uz)) < 0.0f;
    const floatw side = SELECTW(below, 1.0f, -1.0f);
    const floatw x = fma(side, (floatw)ux, nx), y = fma(side, (floatw)uy, ny), z = fma(side, (floatw)uz, nz);
    const floatw off = 0.25f * fma(x, x, fma(y, y, z * z));
    return SELECTW(below, off, 1.0f - off);
}

/* Albedo of a channel, wet and porous to `share`. */
static inline floatw wetted(const floatw dry, const floatw share, const floatw through, const float water, const int paper)
{
    const floatw seen = (paper ? (floatw)(water) : fmin(dry, water)) * through;
    return fma(share, seen - dry, dry);
}

__kernel void wet_ground(
    __global float *restrict albedo,
    __global float *restrict roughness,
    __global const float *restrict metallic,
    __global const float *restrict normal,
    __global const uchar *restrict sky,
    __global const uchar *restrict road,
    __global const float *restrict snow_bare,
    __global float *restrict wetness,
    __global const float *restrict up,                  /* unit, camera frame */
    const float intensity,
    const float porosity,
    const float water_albedo,
    const float water_roughness,
    const float film,
    const float optical_depth,
    const int convention,
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy)  /* [px] */
{
    const int u0 = get_global_id(0) * W, v = get_global_id(1);
    const int i = v * pitch + u0, paper = convention == PAPER;
    FETCH3_TO_CHANGE(albedo + i, plane);
    FETCH_TO_CHANGE(roughness + i);
    FETCH(metallic + i);
    FETCH3(normal + i, plane);
    FETCH(snow_bare + i);
    FETCH_TO_CHANGE(wetness + i);
    const intw seen = LOADMASKW(sky + i) == 0;
    if (!ANYW(seen)) {
        STOREW((floatw)(0.0f), wetness + i);
        return;
    }
    const floatw nx = LOADW(normal + i), ny = LOADW(normal + i + plane), nz = LOADW(normal + i + 2 * plane);
    const floatw unit = RSQRTW(fma(nx, nx, fma(ny, ny, nz * nz)));
    const floatw dry_roughness = LOADW(roughness + i);
    const floatw open = open_to_the_sky(nx * unit, ny * unit, nz * unit, up[0], up[1], up[2]);
    const intw drivable = LOADMASKW(road + i);
    const floatw reached = paper ? SELECTW(drivable, 1.0f, 0.0f) : open * open;
    const floatw closed = paper ? (floatw)(1.0f) : SELECTW(drivable, 1.0f, film);
    const floatw wet = SELECTW(seen, intensity * reached * LOADW(snow_bare + i), 0.0f);
    const floatw porous = clamp((dry_roughness - 0.5f) * 2.5f, 0.0f, 1.0f) * (1.0f - LOADW(metallic + i));
    const floatw share = wet * porosity * (paper ? (floatw)(1.0f) : porous);
    floatw through = 1.0f;
    if (optical_depth > 0.0f) {
        const floatw kx = ((float)u0 + LANES - cx) / fx;
        const float ky = ((float)v - cy) / fy;
        const floatw facing = -unit * rsqrt(fma(kx, kx, fma(ky, ky, 1.0f))) * fma(nx, kx, fma(ny, ky, nz));
        through = exp_negative(-optical_depth / fmax(facing, 1e-6f));
    }
    const floatw smooth = paper ? (floatw)(water_roughness) : fmin(dry_roughness, water_roughness);
    STOREW(wetted(LOADW(albedo + i), share, through, water_albedo, paper), albedo + i);
    STOREW(wetted(LOADW(albedo + i + plane), share, through, water_albedo, paper), albedo + i + plane);
    STOREW(wetted(LOADW(albedo + i + 2 * plane), share, through, water_albedo, paper), albedo + i + 2 * plane);
    STOREW(fma(closed * wet, smooth - dry_roughness, dry_roughness), roughness + i);
    STOREW(wet, wetness + i);
}
