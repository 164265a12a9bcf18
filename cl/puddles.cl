/* puddles.cl - puddles on the road. Mirrors reference_numpy/puddles.py.
 * Paper, supp. "Geometry-Anchored Puddle Modeling".
 *
 * With a share in [0, 1] comes what it leaves of 1, computed by itself: a difference from 1 would lose the digits of what
 * is left, and what is left is the roughness.
 */
#include "include/exp.h"
#include "include/fbm.h"
#include "include/ramps.h"
#include "include/vec.h"
#include "include/world.h"

#define PAPER 1 /* convention */
#define INV_INDEX2 (1.0f / (1.333f * 1.333f))

/* A share and 1 minus it. */
typedef struct {
    floatw of, left;
} Share;

static inline Share both(const Share a, const Share b)
{
    const Share out = {a.of * b.of, fma(a.of, b.left, a.left)};
    return out;
}

/* Ramp from 0 at t = 0 to 1 at t = 1. */
static inline Share ramp(const Sharp t)
{
    const Sharp one = {1.0f, 0.0f}, back = {-t.hi, -t.lo};
    const Sharp rest = sharp_sum(one, back);
    const Share out = {smooth_ramp(t.hi + t.lo), smooth_ramp(rest.hi + rest.lo)};
    return out;
}

/* Under water by noise over a level. */
static inline Share flooded(const Sharp noise, const float level, const float steepness)
{
    const Sharp down = {-level, 0.0f}, middle = {0.5f, 0.0f};
    return ramp(sharp_sum(sharp_product(sharp_sum(noise, down), steepness, 0.0f), middle));
}

/* Under water as printed: smoothstep(0.2, 1, smoothstep(0, 0.7, noise)). */
static inline Share printed_mask(const Sharp noise)
{
    const Sharp one = {1.0f, 0.0f}, down = {-0.2f, 2.98023224e-9f};
    Sharp t = sharp_product(noise, 1.42857146f, -3.40597978e-8f); /* 1 / 0.7 */
    const intw full = t.hi >= 1.0f;
    t.hi = SELECTW(full, one.hi, t.hi);
    t.lo = SELECTW(full, one.lo, t.lo);
    return ramp(sharp_product(sharp_sum(sharp_smooth(t), down), 1.25f, 0.0f));
}

/* a b - c d. Kahan. */
static inline floatw difference(const floatw a, const floatw b, const floatw c, const floatw d)
{
#pragma OPENCL FP_CONTRACT OFF
    const floatw cd = c * d;
    return fma(a, b, -cd) + fma(-c, d, cd);
}

/* How level a surface is, by the squared sine of its slope. */
static inline Share levelness(
    const floatw nx, const floatw ny, const floatw nz, __global const float *restrict up, const float flat, const float steep)
{
    const floatw ux = up[0], uy = up[1], uz = up[2];
    const floatw x = difference(ny, uz, nz, uy), y = difference(nz, ux, nx, uz), z = difference(nx, uy, ny, ux);
    const floatw sin2 = fma(x, x, fma(y, y, z * z)) / fmax(fma(nx, nx, fma(ny, ny, nz * nz)), 1e-36f);
    const float inv = 1.0f / (steep - flat);
    const intw stands = fma(nx, ux, fma(ny, uy, nz * uz)) > 0.0f;
    Share out;
    out.of = SELECTW(stands, smooth_ramp((steep - sin2) * inv), 0.0f);
    out.left = SELECTW(stands, smooth_ramp((sin2 - flat) * inv), 1.0f);
    return out;
}

/* Share of the ground's light that comes through the water, on its refracted way. */
static inline floatw through_water(
    const floatw kx, const float ky, __global const float *restrict up, const float optical_depth)
{
    const floatw across = fma(kx, up[0], fma((floatw)ky, up[1], up[2]));
    const floatw facing = clamp(-across * rsqrt(fma(kx, kx, fma(ky, ky, 1.0f))), 0.0f, 1.0f);
    return exp_negative(-optical_depth * rsqrt(fma(fma(facing, facing, -1.0f), INV_INDEX2, 1.0f)));
}

static inline void darken(__global float *albedo, const floatw share, const floatw through)
{
    STOREW(LOADW(albedo) * fma(share, through - 1.0f, 1.0f), albedo);
}

__kernel void puddles(
    __global const float *restrict depth,               /* [m] */
    __global float *restrict normal,
    __global float *restrict albedo,
    __global float *restrict roughness,
    __global const uchar *restrict sky,
    __global const uchar *restrict road,
    __global const float *restrict snow_bare,
    __global float *restrict puddle,
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    __global const float *restrict to_world,
    __global const float *restrict to_world_lo,
    __global const float *restrict eye,                 /* [m] from the block's corner */
    __global const float *restrict eye_lo,
    __global const int *restrict block,
    __global const float *restrict up,                  /* unit, camera frame */
    const int cells,                                    /* a block */
    const int octaves,
    __global const float *restrict weight,
    const float level,
    const float steepness,
    const float flat,
    const float steep,
    const float optical_depth,
    const int seed,
    const int convention)
{
    const int u0 = get_global_id(0) * W, v = get_global_id(1);
    const int i = v * pitch + u0;
    const intw here = (LOADMASKW(road + i) != 0) & (LOADMASKW(sky + i) == 0);
    if (!ANYW(here)) {
        STOREW((floatw)(0.0f), puddle + i);
        return;
    }
    const floatw du = (float)u0 + LANES - cx;
    const float dv = (float)v - cy;
    const Place at = places(du, dv, LOADW(depth + i), fx, fy, to_world, to_world_lo, eye, eye_lo);
    const float dry = convention == PAPER ? -1.0f : level - 0.5f / steepness - 1e-5f; /* noise under which no water stands */
    const Sharp noise = fbm(at, block, cells, weight, octaves, seed, SELECTW(here, dry, 2.0f));
    const floatw nx = LOADW(normal + i), ny = LOADW(normal + i + plane), nz = LOADW(normal + i + 2 * plane);
    Share under;
    if (convention == PAPER) {
        under = printed_mask(noise);
    } else {
        const floatw left = LOADW(snow_bare + i);
        const Share bare = {left, 1.0f - left};
        under = both(both(flooded(noise, level, steepness), levelness(nx, ny, nz, up, flat, steep)), bare);
    }
    under.of = SELECTW(here, under.of, 0.0f);
    under.left = SELECTW(here, under.left, 1.0f);
    STOREW(under.of, puddle + i);
    const intw wet = under.of > 0.0f;
    if (!ANYW(wet))
        return;
    STOREW(LOADW(roughness + i) * under.left, roughness + i);
    if (convention == PAPER)
        return;
    const floatw through = through_water(du / fx, dv / fy, up, optical_depth);
    darken(albedo + i, under.of, through);
    darken(albedo + i + plane, under.of, through);
    darken(albedo + i + 2 * plane, under.of, through);
    const floatw x = fma(under.of, up[0] - nx, nx), y = fma(under.of, up[1] - ny, ny), z = fma(under.of, up[2] - nz, nz);
    const floatw unit = rsqrt(fmax(fma(x, x, fma(y, y, z * z)), 1e-36f));
    STOREW(SELECTW(wet, x * unit, nx), normal + i);
    STOREW(SELECTW(wet, y * unit, ny), normal + i + plane);
    STOREW(SELECTW(wet, z * unit, nz), normal + i + 2 * plane);
}
