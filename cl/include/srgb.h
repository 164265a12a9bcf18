/* srgb.h - sRGB's transfer function and the luminance of its primaries. Mirrors reference_numpy/srgb.py. */
#ifndef SRGB_H
#define SRGB_H
#include "vec.h"

#define LUMINANCE_R 0.2126f /* Rec. 709 */
#define LUMINANCE_G 0.7152f
#define LUMINANCE_B 0.0722f

static inline floatw luminance_of(const floatw r, const floatw g, const floatw b)
{
    return fma(r, LUMINANCE_R, fma(g, LUMINANCE_G, b * LUMINANCE_B));
}

/* log2(x) of a normal number > 0, by its exponent and a polynomial around 1 (minimax fit of this project to 7e-9). */
static inline floatw log2_positive(const floatw x)
{
    const int root_half = 0x3f3504f3; /* bits of sqrt(1/2): the mantissa is taken from there to sqrt(2) */
    const intw above = as_intw(x) - root_half;
    const floatw exponent = as_floatw((above >> 23) + 0x4b400000) - 12582912.0f; /* 1.5 * 2^23 holds the integer */
    const floatw t = as_floatw((above & 0x007fffff) + root_half) - 1.0f;
    floatw p = fma(t, 1.25427615e-1f, -2.10289657e-1f);
    p = fma(t, p, 2.17365779e-1f);
    p = fma(t, p, -2.38521205e-1f);
    p = fma(t, p, 2.87658754e-1f);
    p = fma(t, p, -3.60721136e-1f);
    p = fma(t, p, 4.80922423e-1f);
    p = fma(t, p, -7.21347129e-1f);
    p = fma(t, p, 1.44269487f);
    return fma(t, p, exponent);
}

/* 2^x for |x| < 126, by a polynomial around 0 (minimax fit of this project to 2e-9). */
static inline floatw exp2_normal(const floatw x)
{
    const floatw shifted = x + 12582912.0f; /* leaves the nearest integer in the low bits */
    const floatw f = x - (shifted - 12582912.0f);
    floatw p = fma(f, 1.54762792e-4f, 1.34002353e-3f);
    p = fma(f, p, 9.61800398e-3f);
    p = fma(f, p, 5.55032791e-2f);
    p = fma(f, p, 2.40226513e-1f);
    p = fma(f, p, 6.93147206e-1f);
    p = fma(f, p, 1.0f);
    return as_floatw(as_intw(p) + (as_intw(shifted) << 23));
}

/* Code of linear light >= 0; the curve goes on beyond 1. */
static inline floatw srgb_encode(const floatw x)
{
    const floatw curve = fma(1.055f, exp2_normal(log2_positive(x) * (1.0f / 2.4f)), -0.055f);
    return SELECTW(x <= 0.0031308f, 12.92f * x, curve);
}

/* Linear light of a code >= 0. */
static inline floatw srgb_decode(const floatw x)
{
    const floatw base = fma(x, 1.0f / 1.055f, 0.055f / 1.055f);
    return SELECTW(x <= 0.04045f, x * (1.0f / 12.92f), exp2_normal(2.4f * log2_positive(base)));
}
#endif
