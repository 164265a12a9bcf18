/* occlusion.h - horizon-based ambient occlusion. Mirrors reference_numpy/occlusion.py. */
#ifndef OCCLUSION_H
#define OCCLUSION_H
#include "gather.h"
#include "shadow.h"
#include "trig.h"
#include "vec.h"

#define FIRST 2          /* [px] the nearest sample */
#define LEAST_NOV 1e-3f

__constant int SLICES[16] = {1, 0, 0, 1, 1, 1, -1, 1, 2, 1, -1, 2, 1, 2, -2, 1};

/* Depth of W pixels from column x on in row y; nothing beyond the picture's borders. */
static inline floatw solid_row(
    __global const float *restrict solid, const int x, const int y, const int width, const int height, const int pitch)
{
    if (y < 0 || y >= height || x <= -W || x >= width)
        return NOTHING;
    if (x >= 0 && x + W <= width)
        return LOADW(solid + y * pitch + x);
    float lanes[W];
    for (int j = 0; j < W; j++)
        lanes[j] = x + j >= 0 && x + j < width ? solid[y * pitch + x + j] : NOTHING;
    return LOADW(lanes);
}

/* Cosine-weighted arc from the eye's direction to a horizon, times 4. Jimenez et al. 2016, eq. 7. */
static inline floatw arc(const floatw horizon, const float side, const floatw sin_g, const floatw cos_g)
{
    const floatw c = clamp(horizon, -1.0f, 1.0f);
    const floatw h = acos_upper(c) * side;
    const floatw signed_s = sqrt(fma(-c, c, 1.0f)) * side;
    /* cos g - cos(2 h - g) = 2 sin h sin(h - g) */
    return 2.0f * fma(signed_s, fma(signed_s, cos_g, -c * sin_g), h * sin_g);
}

/* What the samples of one slice have in common. */
typedef struct {
    floatw depth, stretch;       /* [m], and length of the pixel's ray at depth 1 */
    floatw back, across;         /* of a pixel's step at depth 1: its parts along that ray and square to it */
    float inv_radius2;           /* [1/m^2] */
} Slice;

/* How far a thing at depth z, `step` pixels away, stands out above the surface's own plane, as a cosine to the eye. */
static inline floatw rise(const Slice *s, const floatw z, const float step, const floatw least)
{
    const floatw sideways = step * z, across = sideways * s->across;
    const floatw away = fma(z - s->depth, s->stretch, sideways * s->back);
    const floatw d2 = fma(away, away, fma(across, across, 1e-12f));
    const floatw weight = fmax(fma(-d2, s->inv_radius2, 1.0f), 0.0f);
    return weight * weight * fma(-away, 1.0f / sqrt(d2), -least);
}

/* [px] / focal length: no line of sight farther away comes within the radius of any of the surfaces. That of the ray r is
 * z |r x w| / |r + w| away for a step w square to the axis, and |r x w| >= |w|. */
static inline float last_step(const floatw depth, const floatw stretch, const float radius_m)
{
    return radius_m * MAXW(stretch) / fmax(MINW(depth) - radius_m, 1e-6f);
}

/* Share of the surroundings that surfaces see. */
OUT_OF_LINE floatw ambient_occlusion(
    __global const float *restrict solid,
    const floatw nx, const floatw ny, const floatw nz, const floatw depth, const floatw kx, const float ky,
    const int u0, const int v, const int width, const int height, const int pitch, const float fx, const float fy,
    const float radius_m, const int slices, const int steps)
{
    const int scale = max(1, (int)(fx * (1.0f / 1024) + 0.5f));
    const floatw stretch2 = fma(kx, kx, fma(ky, ky, 1.0f));
    const floatw inv_stretch = rsqrt(stretch2);
    Slice s;
    s.depth = depth;
    s.stretch = stretch2 * inv_stretch;
    s.inv_radius2 = 1.0f / (radius_m * radius_m);
    const floatw n_v = fmax(-fma(nx, kx, fma(ny, (floatw)ky, nz)) * inv_stretch, LEAST_NOV);
    const float last = last_step(depth, s.stretch, radius_m);
    floatw seen = 0.0f, open = 0.0f;
    for (int j = 0; j < slices; j++) {
        const int du = SLICES[2 * j], dv = SLICES[2 * j + 1];
        const float wx = du / fx, wy = dv / fy;
        const floatw along = fma(kx, wx, ky * wy);
        const floatw shift = along * inv_stretch * inv_stretch;
        const floatw ax = fma(-shift, kx, wx), ay = fma(-shift, ky, wy);
        const floatw a2 = fma(ax, ax, fma(ay, ay, shift * shift)), inv_a = rsqrt(a2);
        s.back = along * inv_stretch;
        s.across = a2 * inv_a;
        const floatw n_t = fma(nx, ax, fma(ny, ay, -nz * shift)) * inv_a;
        const floatw length2 = fma(n_t, n_t, n_v * n_v), inv_length = rsqrt(length2), length = length2 * inv_length;
        const floatw sin_g = n_t * inv_length, cos_g = fmin(n_v * inv_length, 1.0f);

        const int farthest = min(scale * FIRST << max(steps - 1, 0), (int)fmin(last / sqrt(fma(wx, wx, wy * wy)), 1e6f));
        const int far_u = farthest * abs(du), far_v = farthest * dv;
        const bool inside = u0 >= far_u && u0 + W + far_u <= width && v >= far_v && v + far_v < height;
        __global const float *here = solid + v * pitch + u0;
        floatw ahead = 0.0f, behind = 0.0f;
        for (int k = 0, step = scale * FIRST; k < steps && step <= farthest; k++, step *= 2) {
            floatw z, z_behind;
            if (inside) {
                z = LOADW(here + step * (dv * pitch + du));
                z_behind = LOADW(here - step * (dv * pitch + du));
            } else {
                z = solid_row(solid, u0 + step * du, v + step * dv, width, height, pitch);
                z_behind = solid_row(solid, u0 - step * du, v - step * dv, width, height, pitch);
            }
            const floatw a = rise(&s, z, (float)step, -sin_g), b = rise(&s, z_behind, (float)-step, sin_g);
            ahead = SELECTW(a > ahead, a, ahead);
            behind = SELECTW(b > behind, b, behind);
        }
        seen = fma(length, arc(ahead - sin_g, 1.0f, sin_g, cos_g) + arc(behind + sin_g, -1.0f, sin_g, cos_g), seen);
        open = fma(length, fma(acos_quarter(cos_g), fabs(sin_g), cos_g), open);
    }
    return clamp(0.25f * seen / open, 0.0f, 1.0f);
}
#endif
