/* world.h - where surfaces lie in the world, exactly enough for its noise. Mirrors reference_numpy/world.py.
 *
 * Places are carried as a float and what that float leaves out: a hundred metres from the eye a float counts in
 * hundredths of millimetres, which a steep noise shows. That forbids the compiler to fuse a product into a sum.
 */
#ifndef WORLD_H
#define WORLD_H
#include "sharp.h"
#include "vec.h"

#define BLOCK 160.0f     /* [m] a side */

/* Places [m] from the corner of the camera's block, along the world's axes. */
typedef struct {
    Sharp x, y, z;
} Place;

/* d z / f: how far a pixel d off the middle [px] lies aside at depth z. */
static inline Sharp aside(const floatw d, const floatw z, const float f)
{
#pragma OPENCL FP_CONTRACT OFF
    const float inv = 1.0f / f;
    const floatw k = d * inv;
    const floatw k_lo = fma(-k, (floatw)f, d) * inv;
    Sharp a;
    a.hi = k * z;
    a.lo = fma(k, z, -a.hi) + k_lo * z;
    return a;
}

/* One world coordinate of camera points (x, y, z), by a row of the rotation and the eye's own. */
static inline Sharp along_axis(
    const Sharp x, const Sharp y, const Sharp z, __global const float *restrict row, __global const float *restrict row_lo,
    const float eye, const float eye_lo)
{
    const Sharp from = {eye, eye_lo};
    const Sharp xy = sharp_sum(sharp_product(x, row[0], row_lo[0]), sharp_product(y, row[1], row_lo[1]));
    return sharp_sum(sharp_sum(sharp_product(z, row[2], row_lo[2]), xy), from);
}

/* Places of the surfaces at depth z that lie (du, dv) pixels off the middle. */
static inline Place places(
    const floatw du, const floatw dv, const floatw depth, const float fx, const float fy,
    __global const float *restrict to_world, __global const float *restrict to_world_lo,
    __global const float *restrict eye, __global const float *restrict eye_lo)
{
    const Sharp x = aside(du, depth, fx), y = aside(dv, depth, fy), z = {depth, 0.0f};
    Place p;
    p.x = along_axis(x, y, z, to_world, to_world_lo, eye[0], eye_lo[0]);
    p.y = along_axis(x, y, z, to_world + 3, to_world_lo + 3, eye[1], eye_lo[1]);
    p.z = along_axis(x, y, z, to_world + 6, to_world_lo + 6, eye[2], eye_lo[2]);
    return p;
}

/* Numbers of the cells, `cells` a block, that one coordinate lies in, and how far into them, 0 to 1. */
static inline intw sharp_cells_of(const Sharp place, const int block, const int cells, Sharp *into)
{
#pragma OPENCL FP_CONTRACT OFF
    const Sharp scaled = sharp_product(place, (float)cells, 0.0f);
    const floatw hi = scaled.hi * (1.0f / BLOCK);
    const floatw lo = (fma(-hi, (floatw)BLOCK, scaled.hi) + scaled.lo) * (1.0f / BLOCK);
    const floatw first = floor(hi);
    const Sharp at = {hi, lo}, back = {-first, 0.0f}, rest = sharp_sum(at, back);
    const floatw more = floor(rest.hi + rest.lo);
    const Sharp back_more = {-more, 0.0f};
    *into = sharp_tidy(sharp_sum(rest, back_more));
    return INTW(first) + INTW(more) + block * cells;
}

/* The same, the place in the cell rounded to a float. */
static inline intw cells_of(const Sharp place, const int block, const int cells, floatw *into)
{
    Sharp rest;
    const intw cell = sharp_cells_of(place, block, cells, &rest);
    *into = rest.hi + rest.lo;
    return cell;
}
#endif
