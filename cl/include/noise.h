/* noise.h - noise on lattices of the world: integer hashes, bit-equal everywhere. Mirrors reference_numpy/noise.py. */
#ifndef NOISE_H
#define NOISE_H
#include "vec.h"

/* Every bit of 32 spread over all of them. Wellons 2018 ("lowbias32"). */
static inline uintw scramble(uintw h)
{
    h = (h ^ (h >> 16)) * 0x7FEB352Du;
    h = (h ^ (h >> 15)) * 0x846CA68Bu;
    return h ^ (h >> 16);
}

/* The part of a cell's hash that all cells of its row share. */
static inline uintw hash_row(const intw z, const uint seed)
{
    return scramble(as_uintw(z) * 0x85EBCA77u + seed);
}

/* A cell's 32 bits, of its integer coordinates. */
static inline uintw hash2(const intw x, const uintw row)
{
    return scramble(as_uintw(x) * 0x9E3779B1u + row);
}

/* A number in [0, 1) out of the upper 24 bits: exact. */
static inline floatw unit(const uintw h)
{
    return FLOATW(h >> 8) * 5.9604644775390625e-8f;
}

/* Numbers in [0, 1) out of the lower and of the upper 16 bits. */
static inline floatw low_half(const uintw h) { return FLOATW(h & 0xFFFFu) * 1.52587890625e-5f; }
static inline floatw high_half(const uintw h) { return FLOATW(h >> 16) * 1.52587890625e-5f; }

/* 0 to 1 without a kink at either end, nor in its slope. Perlin 2002. The upper half from its end: at 1 the polynomial
 * takes 15 from 16. */
static inline floatw fade(const floatw t)
{
    const intw upper = t > 0.5f;
    const floatw s = SELECTW(upper, 1.0f - t, t);
    const floatw f = s * s * s * fma(s, fma(s, (floatw)6.0f, (floatw)-15.0f), (floatw)10.0f);
    return SELECTW(upper, 1.0f - f, f);
}

/* Smooth noise, 0 to 1, in cells (x, z) at the places (u, w) within them, 0 to 1. */
static inline floatw value_noise(const intw x, const intw z, const floatw u, const floatw w, const uint seed)
{
    const floatw fu = fade(u), fw = fade(w);
    const uintw row0 = hash_row(z, seed), row1 = hash_row(z + 1, seed);
    const floatw a = unit(hash2(x, row0)), b = unit(hash2(x + 1, row0));
    const floatw c = unit(hash2(x, row1)), d = unit(hash2(x + 1, row1));
    const floatw near = fma(fu, b - a, a), far = fma(fu, d - c, c);
    return fma(fw, far - near, near);
}
#endif
