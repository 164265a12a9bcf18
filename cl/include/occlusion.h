/* occlusion.h - horizon-based ambient occlusion. Mirrors reference_numpy/occlusion.py. */
#ifndef OCCLUSION_H
#define OCCLUSION_H
#include "gather.h"
#include "shadow.h"
#include "vec.h"

#define FIRST 2          /* [px] the nearest sample */
#define LEAST_NOV 1e-3f
#define HIDDEN 0.0625f   /* share below which a difference of a cosine from 1 needs digits of its own */

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

/* Of a slice, in stretches of the pixel's ray, which makes depths of ways along it. */
typedef struct {
    floatw depth;                /* [m] */
    floatw across, lean;         /* of a pixel's step at depth 1: its part square to the ray, and the other over it */
    floatw soft, inv_radius2;    /* added to d^2; [1/m^2] */
} Slice;

/* 1 - cosine to the eye of the horizon over a thing at depth z, `way` aside at depth 1: that of the surface's own plane,
 * flat = 1 + up, drawn to the thing's own. `fine` keeps the digits of what is nearly 0. */
static inline floatw fall(
    const Slice *s, const floatw z, const floatw way, const floatw lean, const floatw up, const floatw flat,
    const bool fine)
{
    const floatw across = way * z, away = fma(across, lean, z - s->depth);
    const floatw across2 = fma(across, across, s->soft), d2 = fma(away, away, across2);
    const floatw near = fma(-d2, s->inv_radius2, 1.0f), root = SELECTW(near > 0.0f, near, 0.0f), weight = root * root;
    if (!fine)
        return fma(-weight, fma(-away, 1.0f / sqrt(d2), up), flat);
    const floatw e = across2 / fma(sqrt(d2), fabs(away), d2), q = fmin(d2 * s->inv_radius2, 1.0f);
    return fma(weight, SELECTW(away < 0.0f, e, 2.0f - e), q * (2.0f - q) * flat);
}

/* Of the arc from the eye's direction to a horizon of 1 - cosine `fall`, what is weighted by the cosine along the eye's
 * direction, and square to it, where c = 1 - fall:  (1 - c^2) / 2,  (acos c - c sqrt(1 - c^2)) / 2.
 * Jimenez et al. 2016, eq. 7, as cos g - cos(2 h - g) = 2 sin h sin(h - g). The latter goes with fall^(3/2); the fit is
 * minimax, as those of trig.h, to 1.8e-8 (relative). */
static inline floatw arc(const floatw fall, floatw *square)
{
    const floatw other = 2.0f - fall;
    const intw beyond = fall > 1.0f;
    const floatw least = SELECTW(beyond, other, fall), x = SELECTW(least > 0.0f, least, 0.0f);
    floatw p = fma(x, -2.78534015e-4f, 2.16496664e-4f);
    p = fma(x, p, -9.5005427e-4f);
    p = fma(x, p, -2.32900583e-3f);
    p = fma(x, p, -1.26499597e-2f);
    p = fma(x, p, -0.141419789f);
    p = fma(x, p, 0.942809024f);
    p *= x * sqrt(x);
    *square = SELECTW(beyond, 0.5f * M_PI_F - p, p);
    return 0.5f * fall * other;
}

/* cos g + g sin g, 0 <= cos g <= 1, of cos g; the fit is minimax, to 1.2e-8 (relative). */
static inline floatw unhidden(const floatw c)
{
    floatw p = fma(c, -3.63996661e-3f, 2.12412051e-2f);
    p = fma(c, p, -5.96315156e-2f);
    p = fma(c, p, 0.115008126f);
    p = fma(c, p, -0.190814859f);
    p = fma(c, p, 0.332352776f);
    p = fma(c, p, -0.785308956f);
    p = fma(c, p, -3.1668378e-6f);
    return fma(c, p, 1.57079635f);
}

/* [px] / focal length: no line of sight farther away comes within the radius of any of the surfaces. That of the ray r is
 * z |r x w| / |r + w| away for a step w square to the axis, and |r x w| >= |w|. */
static inline float last_step(const floatw depth, const floatw stretch, const float radius_m)
{
    return radius_m * MAXW(stretch) / fmax(MINW(depth) - radius_m, 1e-6f);
}

/* Share of the surroundings that surfaces see; `fine`: shares of nearly 0, too, to a float's digits. */
static inline floatw share_seen(
    __global const float *restrict solid,
    const floatw nx, const floatw ny, const floatw nz, const floatw depth, const floatw kx, const float ky,
    const int u0, const int v, const int width, const int height, const int pitch, const float fx, const float fy,
    const float radius_m, const int slices, const int steps, const bool fine)
{
    const int scale = max(1, (int)(fx * (1.0f / 1024) + 0.5f));
    const floatw stretch2 = fma(kx, kx, fma(ky, ky, 1.0f)), inv_stretch2 = 1.0f / stretch2;
    const floatw stretch = sqrt(stretch2);
    const floatw towards = -fma(nx, kx, fma(ny, (floatw)ky, nz)) * stretch * inv_stretch2, n_v = fmax(towards, LEAST_NOV);
    Slice s;
    s.depth = depth;
    s.soft = 1e-12f * inv_stretch2;
    s.inv_radius2 = stretch2 * (1.0f / (radius_m * radius_m));
    const float last = last_step(depth, stretch, radius_m);
    floatw seen = 0.0f, open = 0.0f;
    for (int j = 0; j < slices; j++) {
        /* The step w beside the ray r is |r x w| / |r| long; of r it has r.w / |r|. */
        const int du = SLICES[2 * j], dv = SLICES[2 * j + 1];
        const float wx = du / fx, wy = dv / fy, w2 = fma(wx, wx, wy * wy);
        const floatw along = fma(kx, wx, ky * wy), turn = fma(kx, wy, -ky * wx);
        const floatw beside2 = fma(turn, turn, w2), inv_beside = 1.0f / sqrt(beside2);
        s.across = beside2 * inv_beside * inv_stretch2;
        s.lean = along * inv_beside;
        const floatw n_t = fma(fma(nx, wx, ny * wy), stretch, along * towards) * inv_beside;
        const floatw length2 = fma(n_t, n_t, n_v * n_v), inv_length = 1.0f / sqrt(length2), length = length2 * inv_length;
        const floatw sin_g = n_t * inv_length, cos_g = n_v * inv_length;

        const int farthest = min(scale * FIRST << max(steps - 1, 0), (int)fmin(last / sqrt(w2), 1e6f));
        const int far_u = farthest * abs(du), far_v = farthest * dv;
        const bool inside = u0 >= far_u && u0 + W + far_u <= width && v >= far_v && v + far_v < height;
        __global const float *here = solid + v * pitch + u0;
        floatw flat = 1.0f + sin_g, flat_behind = 1.0f - sin_g;
        if (fine) {
            const floatw least = cos_g * cos_g / (1.0f + fabs(sin_g));
            flat = SELECTW(sin_g < 0.0f, least, flat);
            flat_behind = SELECTW(sin_g > 0.0f, least, flat_behind);
        }
        floatw ahead = flat, behind = flat_behind;
        for (int k = 0, step = scale * FIRST; k < steps && step <= farthest; k++, step *= 2) {
            floatw z, z_behind;
            if (inside) {
                z = LOADW(here + step * (dv * pitch + du));
                z_behind = LOADW(here - step * (dv * pitch + du));
            } else {
                z = solid_row(solid, u0 + step * du, v + step * dv, width, height, pitch);
                z_behind = solid_row(solid, u0 - step * du, v - step * dv, width, height, pitch);
            }
            const floatw way = s.across * (float)step;
            const floatw a = fall(&s, z, way, s.lean, sin_g, flat, fine);
            const floatw b = fall(&s, z_behind, way, -s.lean, -sin_g, flat_behind, fine);
            ahead = SELECTW(a < ahead, a, ahead);
            behind = SELECTW(b < behind, b, behind);
        }
        floatw one, other;
        const floatw along_eye = arc(ahead, &one) + arc(behind, &other);
        seen = fma(length, fma(cos_g, along_eye, sin_g * (one - other)), seen);
        open = fma(length, unhidden(cos_g), open);
    }
    return clamp(seen / open, 0.0f, 1.0f);
}

OUT_OF_LINE floatw roughly(
    __global const float *restrict solid,
    const floatw nx, const floatw ny, const floatw nz, const floatw depth, const floatw kx, const float ky,
    const int u0, const int v, const int width, const int height, const int pitch, const float fx, const float fy,
    const float radius_m, const int slices, const int steps)
{
    return share_seen(
        solid, nx, ny, nz, depth, kx, ky, u0, v, width, height, pitch, fx, fy, radius_m, slices, steps, false);
}

OUT_OF_LINE floatw finely(
    __global const float *restrict solid,
    const floatw nx, const floatw ny, const floatw nz, const floatw depth, const floatw kx, const float ky,
    const int u0, const int v, const int width, const int height, const int pitch, const float fx, const float fy,
    const float radius_m, const int slices, const int steps)
{
    return share_seen(
        solid, nx, ny, nz, depth, kx, ky, u0, v, width, height, pitch, fx, fy, radius_m, slices, steps, true);
}

/* Share of the surroundings that surfaces see. */
static inline floatw ambient_occlusion(
    __global const float *restrict solid, const intw surface,
    const floatw nx, const floatw ny, const floatw nz, const floatw depth, const floatw kx, const float ky,
    const int u0, const int v, const int width, const int height, const int pitch, const float fx, const float fy,
    const float radius_m, const int slices, const int steps)
{
    const floatw share = roughly(
        solid, nx, ny, nz, depth, kx, ky, u0, v, width, height, pitch, fx, fy, radius_m, slices, steps);
    const intw hidden = share < HIDDEN;
    if (!ANYW(surface & hidden))
        return share;
    return SELECTW(hidden, finely(
        solid, nx, ny, nz, depth, kx, ky, u0, v, width, height, pitch, fx, fy, radius_m, slices, steps), share);
}
#endif
