/* tiles.h - the lights that can reach what lies in a tile of the picture, a bit each: by the ball that holds all that a light
 * can reach against the tile's frustum between two depths. A light that is left out would have added 0. */
#ifndef TILES_H
#define TILES_H
#include "vec.h"

#define SLACK 1e-3f      /* covers rounding */

/* A tile's frustum: x = k z at its sides, depths [m]. */
typedef struct {
    float left, right, top, bottom, near, far;
} Frustum;

/* Of the tile whose first pixel is (u0, v0), between the nearest and the farthest surface; pixels of the sky reach to
 * `sky_far`. Nothing but sky: near > far, if sky_far is -INFINITY. */
static inline Frustum frustum(
    __global const float *restrict depth, __global const uchar *restrict sky, const float sky_far,
    const int pitch, const int height, const int u0, const int v0,
    const float fx, const float fy, const float cx, const float cy)
{
    floatw near = INFINITY, far = -INFINITY;
    for (int v = v0; v < min(v0 + TILE, height); v++)
        for (int u = u0; u < min(u0 + TILE, pitch); u += W) {
            const int i = v * pitch + u;
            FETCH(depth + i);
            FETCH(sky + i);
            const floatw z = LOADW(depth + i);
            const intw none = LOADMASKW(sky + i);
            near = fmin(near, SELECTW(none, INFINITY, z));
            far = fmax(far, SELECTW(none, sky_far, z));
        }
    Frustum a;
    a.left = (u0 - cx) / fx; a.right = (u0 + TILE - 1 - cx) / fx;
    a.top = (v0 - cy) / fy; a.bottom = (v0 + TILE - 1 - cy) / fy;
    a.near = MINW(near); a.far = MAXW(far);
    return a;
}

/* Whether a ball reaches beyond the plane through the eye that holds all x = k z, on the side where sign (x - k z) > 0. */
static inline bool beyond(const float x, const float z, const float radius, const float k, const float sign)
{
    return sign * (x - k * z) > radius * sqrt(1.0f + k * k);
}

static inline bool meets(const Frustum a, const float4 ball)
{
    const float radius = ball.w + SLACK * (ball.w + fabs(ball.z));
    return !(ball.z + radius < a.near || ball.z - radius > a.far || a.near > a.far
        || beyond(ball.x, ball.z, radius, a.left, -1.0f) || beyond(ball.x, ball.z, radius, a.right, 1.0f)
        || beyond(ball.y, ball.z, radius, a.top, -1.0f) || beyond(ball.y, ball.z, radius, a.bottom, 1.0f));
}

/* Bits of the 32 lights from number 32 * word on. */
static inline uint meeting(const Frustum a, const int word, const int light_count, __global const float *restrict light_ball)
{
    uint bits = 0;
    for (int l = 32 * word; l < min(32 * word + 32, light_count); l++)
        bits |= meets(a, vload4(l, light_ball)) ? 1u << (l - 32 * word) : 0u;
    return bits;
}

/* The number of the lowest light of a word's bits. */
static inline int lowest(const int word, const uint bits)
{
    return 32 * word + 31 - clz(bits & -bits);
}
#endif
