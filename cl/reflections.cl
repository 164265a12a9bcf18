/* reflections.cl - what wet ground mirrors of the frame itself. Mirrors reference_numpy/reflections.py.
 *
 * Two stages: reflections_pixels keeps radiance and depth as they were while the picture changes, and means of blocks of
 * rows; reflections walks the mirrored rays.
 */
#include "include/brdf.h"
#include "include/columns.h"
#include "include/environment.h"
#include "include/gather.h"
#include "include/mirrored.h"
#include "include/ramps.h"
#include "include/row_means.h"
#include "include/vec.h"
#include "include/walk.h"

#define WET 0.25f
#define SMOOTH 0.5f
#define SLACK 1e-3f      /* [1] far more than rounding */
#define NOTHING 1e6f     /* [m] depth of the sky */

/* A row of the copy and of the means is a tile longer than the picture's: it ends with its last pixel once more, since pixels
 * are looked up in pairs. */
INLINE void write_row(__global float *restrict to, const floatw x, const int last)
{
    STOREW(x, to);
    if (last)
        to[W] = LAST(x);
}

/* A work-item keeps a vector of as many rows as the largest block has, more than a strip, so that a few have none. */
__kernel void reflections_pixels(
    __global float *restrict reflection_pixels,
    __global float *restrict reflection_means,
    __global const float *restrict rgb,
    __global const float *restrict emissive,
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
    const int height,                                   /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane)                                    /* [px] distance between the planes of one image */
{
    const int u0 = get_global_id(0) * W, first = get_global_id(1) * LARGEST_BLOCK, end = min(first + LARGEST_BLOCK, height);
    const int row = pitch + TILE, apart = height * row, last = u0 + W == pitch;
    floatw sum[BLOCKS + 1][4];
    for (int j = 0; j < 4 * (BLOCKS + 1); j++)
        sum[j / 4][j % 4] = 0.0f;
    for (int v = first; v < end; v++) {
        const int i = v * pitch + u0, to = v * row + u0;
        const floatw z = SELECTW(LOADMASKW(sky + i), NOTHING, fmin(LOADW(depth + i), NOTHING));
        const intw solid = z < NOTHING;
        write_row(reflection_pixels + to, z, last);
        sum[0][3] += SELECTW(solid, 1.0f, 0.0f);
        #pragma unroll
        for (int c = 0; c < 3; c++) {
            const floatw L = LOADW(rgb + i + c * plane);
            write_row(reflection_pixels + to + (c + 1) * apart, L, last);
            sum[0][c] += SELECTW(solid, fmax(L - LOADW(emissive + i + c * plane), 0.0f), 0.0f);
        }
        /* with the last row of a block; blocks end where smaller ones do */
        #pragma unroll
        for (int block = 0; block < BLOCKS && (v == end - 1 || (v + 1) % BLOCK_ROWS[block] == 0); block++) {
            const int rows = BLOCK_ROWS[block];
            const float inv = 1.0f / (v % rows + 1);
            __global float *restrict mean = reflection_means + first_mean(block, height, row) + v / rows * row + u0;
            #pragma unroll
            for (int c = 0; c < 4; c++) {
                write_row(mean + c * blocks_of(rows, height) * row, sum[block][c] * inv, last);
                sum[block + 1][c] += sum[block][c];
                sum[block][c] = 0.0f;
            }
        }
    }
}

/* The lobes that stand for the reflection's as one: shares A and B of the parts of Schlick's Fresnel term, and turn and
 * roughness in the mean. A texel's lobes lie side by side, so that lanes are looked up one by one, and then turned. */
INLINE void mean_lobe(
    __global const float *restrict env_brdf, const Corner at, const floatw F0,
    floatw *A, floatw *B, floatw *turn, floatw *roughness)
{
    int texel[W];
    float right[W], lower[W], shares[4 * W], turns[4 * W], widths[4 * W];
    STOREW(at.at, texel);
    STOREW(at.fx, right);
    STOREW(at.fy, lower);
    for (int j = 0; j < W; j++) {
        __global const float *restrict p = env_brdf + texel[j] * 4 * LOBES, *restrict q = p + at.row * 4 * LOBES;
        const float16 a = vload16(0, p), b = vload16(1, p), c = vload16(0, q), d = vload16(1, q);
        const float16 top = fma((float16)right[j], b - a, a), low = fma((float16)right[j], d - c, c);
        const float16 lobe = fma((float16)lower[j], low - top, top);
        vstore4(lobe.s048c, j, shares);
        vstore4(lobe.s159d, j, turns);
        vstore4(lobe.s26ae, j, widths);
    }
    const Quad share = transposed(shares), t = transposed(turns), w = transposed(widths);
    *A = share.x + share.y + share.z;
    *B = share.w;
    const floatw inv = 1.0f / fma(F0, *A, *B);
    *turn = fma(F0, fma(share.x, t.x, fma(share.y, t.y, share.z * t.z)), share.w * t.w) * inv;
    *roughness = fma(F0, fma(share.x, w.x, fma(share.y, w.y, share.z * w.z)), share.w * w.w) * inv;
}

/* What the kernel is given; its body is out of line. */
typedef struct {
    __global float *rgb;                                /* scene-linear */
    __global const float *reflection_pixels;
    __global const float *reflection_means;
    __global const float *depth;                        /* [m] */
    __global const float *normal;
    __global const float *albedo;
    __global const float *roughness;
    __global const float *metallic;
    __global const uchar *sky;
    __global const float *puddle;
    __global const float *wetness;
    __global const float *occlusion;
#ifdef LAYERS
    __global float *reflection;
#endif
    int width, height;                                  /* [px] */
    int pitch;                                          /* [px] row length, a multiple of W */
    int plane;                                          /* [px] distance between the planes of one image */
    float fx, fy, cx, cy;                               /* [px] */
    __global const float *up;                           /* the world's, camera frame */
    __global const float *env_rotation;                 /* camera to world */
    Surroundings surroundings;
    __global const float *env_brdf;
    int env_brdf_size;
    int steps;
    float reach_m;                                      /* [m] */
    float thickness_m;                                  /* [m] */
    float max_roughness;
} Frame;

/* Whether mirrored rays may rise in the picture as steeply as `mirrored` asks; those of walls do not. What rounding may hide
 * is taken for steep. */
INLINE intw may_rise(const floatw ny, const floatw nz, const floatw nn, const float fy, const float dv)
{
    const floatw up = fma(nz, (floatw)dv, -fy * ny), least = fmax((1.0f - SLACK) * MIN_RISE * fy - SLACK * fabs(dv), 0.0f);
    return (up > 0.0f) & (up * up > least * least * nn);
}

/* Adds what the pixels (u0 to u0 + W - 1, v) mirror. */
OUT_OF_LINE void mirror(const Frame *f, const int u0, const int v)
{
    const int i = v * f->pitch + u0;
#ifdef LAYERS
    STOREW((floatw)0.0f, f->reflection + i);
    STOREW((floatw)0.0f, f->reflection + i + f->plane);
    STOREW((floatw)0.0f, f->reflection + i + 2 * f->plane);
#endif
    FETCH(f->puddle + i);
    FETCH(f->wetness + i);
    const floatw wet = ramp(fmax(LOADW(f->puddle + i), LOADW(f->wetness + i)) * (1.0f / WET));
    if (!ANYW(wet > 0.0f))
        return;
    FETCH(f->roughness + i);
    FETCH(f->sky + i);
    FETCH(f->depth + i);
    FETCH3(f->normal + i, f->plane);
    const floatw rough = LOADW(f->roughness + i);
    const floatw n0 = LOADW(f->normal + i), n1 = LOADW(f->normal + i + f->plane), n2 = LOADW(f->normal + i + 2 * f->plane);
    const floatw nn = fma(n0, n0, fma(n1, n1, n2 * n2));
    const intw on = (wet > 0.0f) & (rough < f->max_roughness) & !LOADMASKW(f->sky + i)
        & may_rise(n1, n2, nn, f->fy, (float)v - f->cy);
    if (!ANYW(on))
        return;

    const intw whole = nn > 1e-12f;
    const floatw nx = SELECTW(whole, n0, 0.0f), ny = SELECTW(whole, n1, 0.0f), nz = SELECTW(whole, n2, -1.0f);
    const float3 upward = vload3(0, f->up);
    const floatw u = (float)u0 + LANES;
    Mirrored m = mirrored(
        nx, ny, nz, fmin(LOADW(f->depth + i), NOTHING), u, (float)v, rough, f->fx, f->fy, f->cx, f->cy, upward,
        bound_of_rays(f->width, f->height, f->fx, f->fy, f->cx, f->cy));
    const floatw weight = wet * smooth_ramp((f->max_roughness - rough) / (SMOOTH * f->max_roughness)) * m.fit;
    m.on = on & (weight > 0.0f);
    Walk k;
    k.pixels = f->reflection_pixels;
    k.means = f->reflection_means;
    k.width = f->width;
    k.height = f->height;
    k.row = f->pitch + TILE;
    k.apart = f->height * k.row;
    k.u = u0;
    k.v = v;
    k.lean = 0.5f * (MINW(SELECTW(m.on, m.lean.hi, 1.0f)) + MAXW(SELECTW(m.on, m.lean.hi, -1.0f)));
    k.inv_fy = 1.0f / f->fy;
    k.inv_edge_v = 1.0f / (EDGE * f->height);
    k.reach_m = f->reach_m;
    k.inv_reach_fade = 1.0f / (FADE * f->reach_m);
    k.thickness_m = f->thickness_m;
    const Sums s = walk(&k, &m, f->steps);
    const intw changed = m.on & (s.own > 0.0f);
#ifndef LAYERS
    if (!ANYW(changed))
        return;
#endif

    FETCH(f->metallic + i);
    FETCH(f->occlusion + i);
    FETCH3(f->albedo + i, f->plane);
    FETCH3_TO_CHANGE(f->rgb + i, f->plane);
    const floatw cr = clamp(LOADW(f->albedo + i), 0.0f, 1.0f);
    const floatw cg = clamp(LOADW(f->albedo + i + f->plane), 0.0f, 1.0f);
    const floatw cb = clamp(LOADW(f->albedo + i + 2 * f->plane), 0.0f, 1.0f);
    const floatw metal = LOADW(f->metallic + i);
    const floatw fr = fma(cr - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    const floatw fg = fma(cg - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    const floatw fb = fma(cb - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    floatw A, B, turn, lobe_rough, X, Y, Z;
    mean_lobe(
        f->env_brdf, lobe_corner(m.NoV, rough, f->env_brdf_size), (fr + fg + fb) * (1.0f / 3.0f),
        &A, &B, &turn, &lobe_rough);
    const floatw unit = 1.0f / sqrt(fma(nx, nx, fma(ny, ny, nz * nz))), to_n = fma(1.0f - turn, 2.0f * m.NoV, turn) * unit;
    const floatw kx = (u - f->cx) / f->fx;
    const float ky = ((float)v - f->cy) / f->fy;
    const floatw ahead = (1.0f - turn) / sqrt(fma(kx, kx, fma(ky, ky, 1.0f)));
    to_world(f->env_rotation, fma(to_n, nx, ahead * kx), fma(to_n, ny, ahead * ky), fma(to_n, nz, ahead), &X, &Y, &Z);
    const Quad around = light_around(&f->surroundings, X, Y, Z, lobe_rough);
    const floatw open = specular_occlusion(m.NoV, LOADW(f->occlusion + i), rough), taken = s.own * open;
    const floatw by_r = weight * fma(fr, A, B), by_g = weight * fma(fg, A, B), by_b = weight * fma(fb, A, B);
    const floatw r = LOADW(f->rgb + i), g = LOADW(f->rgb + i + f->plane), b = LOADW(f->rgb + i + 2 * f->plane);
    STOREW(SELECTW(changed, fmax(fma(by_r, fma(-taken, around.x, s.r), r), 0.0f), r), f->rgb + i);
    STOREW(SELECTW(changed, fmax(fma(by_g, fma(-taken, around.y, s.g), g), 0.0f), g), f->rgb + i + f->plane);
    STOREW(SELECTW(changed, fmax(fma(by_b, fma(-taken, around.z, s.b), b), 0.0f), b), f->rgb + i + 2 * f->plane);
#ifdef LAYERS
    const floatw left = open * s.left;
    STOREW(SELECTW(m.on, by_r * fma(left, around.x, s.r), 0.0f), f->reflection + i);
    STOREW(SELECTW(m.on, by_g * fma(left, around.y, s.g), 0.0f), f->reflection + i + f->plane);
    STOREW(SELECTW(m.on, by_b * fma(left, around.z, s.b), 0.0f), f->reflection + i + 2 * f->plane);
#endif
}

__kernel void reflections(
    __global float *restrict rgb,                       /* scene-linear */
    __global const float *restrict reflection_pixels,
    __global const float *restrict reflection_means,
    __global const float *restrict depth,               /* [m] */
    __global const float *restrict normal,
    __global const float *restrict albedo,
    __global const float *restrict roughness,
    __global const float *restrict metallic,
    __global const uchar *restrict sky,
    __global const float *restrict puddle,
    __global const float *restrict wetness,
    __global const float *restrict occlusion,
#ifdef LAYERS
    __global float *restrict reflection,
#endif
    const int width, const int height,                  /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    __global const float *restrict up,                  /* the world's, camera frame */
    __global const float *restrict env_rotation,        /* camera to world */
    __global const float *restrict env_specular,
    __global const float *restrict env_brdf,
    __global const float *restrict env_zonal,
    __global const float *restrict env_colour,
    const int env_levels, const int env_size, const int env_brdf_size, const int env_elevations,
    const int steps,
    const float reach_m,                                /* [m] */
    const float thickness_m,                            /* [m] */
    const float max_roughness)
{
    const Surroundings surroundings = {env_specular, env_zonal, env_colour, env_levels, env_size, env_elevations};
    const Frame f = {
        rgb, reflection_pixels, reflection_means, depth, normal, albedo, roughness, metallic, sky, puddle, wetness,
        occlusion,
#ifdef LAYERS
        reflection,
#endif
        width, height, pitch, plane, fx, fy, cx, cy, up, env_rotation, surroundings, env_brdf, env_brdf_size,
        steps, reach_m, thickness_m, max_roughness};
    mirror(&f, get_global_id(0) * W, get_global_id(1));
}
