/* fbm.h - fractal noise of the world. Mirrors reference_numpy/fbm.py.
 *
 * What is taken from the noise, a shoreline, is many times steeper than the noise: it is summed as hi + lo.
 */
#ifndef FBM_H
#define FBM_H
#include "noise.h"
#include "vec.h"
#include "world.h"

/* t^2 (3 - 2 t), 0 to 1 without a kink at either end. */
static inline Sharp sharp_smooth(const Sharp t)
{
    const Sharp three = {3.0f, 0.0f}, twice = {-2.0f * t.hi, -2.0f * t.lo};
    const Sharp square = sharp_product(t, t.hi, t.lo), rest = sharp_sum(three, twice);
    return sharp_product(square, rest.hi, rest.lo);
}

/* fade() of noise.h. */
static inline Sharp sharp_fade(const Sharp t)
{
    const Sharp minus_15 = {-15.0f, 0.0f}, ten = {10.0f, 0.0f};
    const Sharp square = sharp_product(t, t.hi, t.lo), cube = sharp_product(square, t.hi, t.lo);
    const Sharp slope = sharp_sum(sharp_product(t, 6.0f, 0.0f), minus_15);
    const Sharp rest = sharp_sum(sharp_product(slope, t.hi, t.lo), ten);
    return sharp_product(cube, rest.hi, rest.lo);
}

/* a + f (b - a) for multiples a, b of 2^-24. */
static inline Sharp sharp_between(const floatw a, const floatw b, const Sharp f)
{
    const Sharp from = {a, 0.0f};
    return sharp_sum(sharp_product(f, b - a, 0.0f), from);
}

/* value_noise() of noise.h. */
static inline Sharp sharp_value_noise(const intw x, const intw z, const Sharp u, const Sharp w, const uint seed)
{
    const Sharp fu = sharp_fade(u), fw = sharp_fade(w);
    const uintw row0 = hash_row(z, seed), row1 = hash_row(z + 1, seed);
    const Sharp near = sharp_between(unit(hash2(x, row0)), unit(hash2(x + 1, row0)), fu);
    const Sharp far = sharp_between(unit(hash2(x, row1)), unit(hash2(x + 1, row1)), fu);
    const Sharp back = {-near.hi, -near.lo};
    const Sharp step = sharp_sum(far, back);
    return sharp_sum(sharp_product(fw, step.hi, step.lo), near);
}

/* Octaves of value noise, each of twice as many cells as the one before and of its own weight. Of no lane that can come to
 * more than `least` the sum ends early, somewhere below it. */
static inline Sharp fbm(
    const Place at, __global const int *restrict block, const int cells, __global const float *restrict weight,
    const int octaves, const int seed, const floatw least)
{
    Sharp sum = {0.0f, 0.0f};
    float rest = 0.0f; /* what the octaves to come can add: noise is less than 1 */
    for (int o = 0; o < octaves; o++)
        rest += weight[o];
    for (int o = 0; o < octaves && ANYW(sum.hi + rest > least); o++) {
        rest -= weight[o];
        Sharp u, w;
        const intw x = sharp_cells_of(at.x, block[0], cells << o, &u);
        const intw z = sharp_cells_of(at.z, block[2], cells << o, &w);
        sum = sharp_sum(sharp_product(sharp_value_noise(x, z, u, w, (uint)(seed + o)), weight[o], 0.0f), sum);
    }
    return sum;
}
#endif
