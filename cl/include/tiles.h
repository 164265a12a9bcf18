/* tiles.h - the lights that can reach what lies in a tile of the picture, a bit each: by the ball that holds all that a light
 * can reach against the tile's frustum between two depths. A light that is left out would have added 0. */
#ifndef TILES_H
#define TILES_H
#include "vec.h"

#define SLACK 1e-3f      /* covers rounding */

/* W tiles side by side, a lane each: their frusta, x = k z at the sides, depths [m]. */
typedef struct {
    floatw left, right, top, bottom, near, far;
} Frusta;

/* Nearest and farthest surface of the tile whose first pixel is (u0, v0); pixels of the sky reach to `sky_far`. */
static inline void depths_of(
    __global const float *restrict depth, __global const uchar *restrict sky, const float sky_far,
    const int pitch, const int height, const int u0, const int v0, float *nearest, float *farthest)
{
    floatw near = INFINITY, far = -INFINITY;
    for (int v = v0; v < min(v0 + TILE, height); v++)
        for (int u = u0; u < min(u0 + TILE, pitch); u += W) {
            const int i = v * pitch + u;
            FETCH(depth + i);
            FETCH(sky + i);
            const floatw z = LOADW(depth + i);
            const intw none = LOADMASKW(sky + i);
            near = min(near, SELECTW(none, INFINITY, z));
            far = max(far, SELECTW(none, sky_far, z));
        }
    *nearest = MINW(near);
    *farthest = MAXW(far);
}

/* Of the tiles whose first pixels are (u0, v0) and each TILE pixels on. Nothing but sky: near > far, if sky_far is -INFINITY;
 * a tile outside the picture, too. */
static inline Frusta frusta(
    __global const float *restrict depth, __global const uchar *restrict sky, const float sky_far,
    const int pitch, const int height, const int u0, const int v0,
    const float fx, const float fy, const float cx, const float cy)
{
    float near[W], far[W];
    for (int j = 0; j < W; j++)
        depths_of(depth, sky, sky_far, pitch, height, u0 + j * TILE, v0, near + j, far + j);
    const floatw u = (float)u0 + (float)TILE * LANES;
    Frusta a;
    a.left = (u - cx) / fx; a.right = (u + (float)(TILE - 1) - cx) / fx;
    a.top = (v0 - cy) / fy; a.bottom = (v0 + TILE - 1 - cy) / fy;
    a.near = LOADW(near); a.far = LOADW(far);
    return a;
}

/* Where a ball reaches beyond the plane through the eye that holds all x = k z, on the side where sign (x - k z) > 0. */
static inline intw beyond(const float x, const float z, const float radius, const floatw k, const float sign)
{
    return sign * (x - k * z) > radius * sqrt(fma(k, k, 1.0f));
}

static inline intw meets(const Frusta a, const float4 ball)
{
    const float radius = ball.w + SLACK * (ball.w + fabs(ball.z));
    return !((ball.z + radius < a.near) | (ball.z - radius > a.far) | (a.near > a.far)
        | beyond(ball.x, ball.z, radius, a.left, -1.0f) | beyond(ball.x, ball.z, radius, a.right, 1.0f)
        | beyond(ball.y, ball.z, radius, a.top, -1.0f) | beyond(ball.y, ball.z, radius, a.bottom, 1.0f));
}

/* The bit of light l in its word, for the tiles that it reaches. */
static inline uintw bit_of(const int l, const intw reaches)
{
    return select((uintw)(0u), (uintw)(1u << (l % 32)), reaches);
}

/* Writes a word of the tiles that begin at column `first` of a row of `columns`. */
static inline void store_word(
    const uintw bits, __global uint *restrict row, const int first, const int columns, const int word, const int words)
{
    uint each[W];
    STOREW(bits, each);
    for (int j = 0; j < min(W, columns - first); j++)
        row[words * (first + j) + word] = each[j];
}

/* The number of the lowest light of a word's bits. */
static inline int lowest(const int word, const uint bits)
{
    return 32 * word + 31 - clz(bits & -bits);
}
#endif
