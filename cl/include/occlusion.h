/* occlusion.h - horizon-based ambient occlusion. Mirrors reference_numpy/occlusion.py. */
#ifndef OCCLUSION_H
#define OCCLUSION_H
#include "gather.h"
#include "shadow.h"
#include "trig.h"
#include "vec.h"

#if W == 1
#define LOADPRIVATEW(p) (*(p))
#else
#define LOADPRIVATEW(p) JOIN(vload, W)(0, p)
#endif
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
    return LOADPRIVATEW(lanes);
}

/* Cosine-weighted arc from the eye's direction to a horizon, times 4. Jimenez et al. 2016, eq. 7. */
static inline floatw arc(const floatw horizon, const float side, const floatw sin_g, const floatw cos_g)
{
    const floatw c = clamp(horizon, -1.0f, 1.0f);
    const floatw s = sqrt(fma(-c, c, 1.0f));
    const floatw h = atan2_upper(s, c) * side;
    const floatw signed_s = s * side;
    /* cos g - cos(2 h - g) = 2 sin h sin(h - g) */
    return 2.0f * fma(signed_s, fma(signed_s, cos_g, -c * sin_g), h * sin_g);
}

/* Share of the surroundings that surfaces see. */
static inline floatw ambient_occlusion(
    __global const float *restrict solid,
    const floatw nx, const floatw ny, const floatw nz, const floatw depth, const floatw kx, const float ky,
    const int u0, const int v, const int width, const int height, const int pitch, const float fx, const float fy,
    const float radius_m, const int slices, const int steps)
{
    const int scale = max(1, (int)(fx * (1.0f / 1024) + 0.5f));
    const floatw stretch2 = fma(kx, kx, fma(ky, ky, 1.0f));
    const floatw inv_stretch = rsqrt(stretch2), stretch = stretch2 * inv_stretch;
    const floatw n_v = fmax(-fma(nx, kx, fma(ny, (floatw)ky, nz)) * inv_stretch, LEAST_NOV);
    const float inv_radius2 = 1.0f / (radius_m * radius_m);
    floatw seen = 0.0f, open = 0.0f;
    for (int j = 0; j < slices; j++) {
        const int du = SLICES[2 * j], dv = SLICES[2 * j + 1];
        const float wx = du / fx, wy = dv / fy;
        const floatw along = fma(kx, wx, ky * wy);
        const floatw shift = along * inv_stretch * inv_stretch;
        const floatw ax = fma(-shift, kx, wx), ay = fma(-shift, ky, wy);
        const floatw inv_a = rsqrt(fma(ax, ax, fma(ay, ay, shift * shift)));
        const floatw n_t = fma(nx, ax, fma(ny, ay, -nz * shift)) * inv_a;
        const floatw length = sqrt(fma(n_t, n_t, n_v * n_v));
        const floatw sin_g = n_t / length, cos_g = n_v / length;
        const floatw g = copysign(atan2_quarter(fabs(n_t), n_v), n_t);
        for (int side = 1; side >= -1; side -= 2) {
            const floatw least = -side * sin_g;
            floatw horizon = least;
            for (int k = 0; k < steps; k++) {
                const int step = side * scale * (FIRST << k);
                const floatw z = solid_row(solid, u0 + step * du, v + step * dv, width, height, pitch);
                const floatw deeper = z - depth;
                const floatw ox = step * wx * z, oy = step * wy * z;
                const floatw tx = fma(kx, deeper, ox), ty = fma((floatw)ky, deeper, oy);
                const floatw d2 = fma(tx, tx, fma(ty, ty, deeper * deeper));
                const floatw towards_eye = -fma(deeper, stretch, step * along * z * inv_stretch);
                const floatw weight = clamp(fma(-d2, inv_radius2, 1.0f), 0.0f, 1.0f);
                const floatw cosine = towards_eye * rsqrt(fmax(d2, 1e-12f));
                horizon = fmax(horizon, fma(weight * weight, cosine - least, least));
            }
            seen = fma(length, arc(horizon, (float)side, sin_g, cos_g), seen);
        }
        open = fma(length, fma(g, sin_g, cos_g), open);
    }
    return clamp(0.25f * seen / open, 0.0f, 1.0f);
}
#endif
