/* exp.h - exponential of numbers <= 0, by polynomial: half the time of the built-in on wide vectors. */
#ifndef EXP_H
#define EXP_H
#include "vec.h"

/* exp(x) for x <= 0, to 2e-7 (relative); about 0 below -87, where float32 ends. x = n ln 2 + f, with ln 2 in two parts
 * (Cody and Waite 1980); the polynomial is a minimax fit of this project to 3e-9 on |f| <= 0.347. */
static inline floatw exp_negative(const floatw x)
{
    const float magic = 12582912.0f; /* 1.5 * 2^23: adding it leaves the nearest integer in the low bits */
    const floatw y = fmax(x, -87.0f);
    const floatw shifted = fma(y, M_LOG2E_F, magic);
    const floatw n = shifted - magic;
    const floatw f = fma(n, 2.12194440e-4f, fma(n, -0.693359375f, y));
    floatw p = fma(f, 1.3814431e-3f, 8.3687967e-3f);
    p = fma(f, p, 4.1668396e-2f);
    p = fma(f, p, 1.6666520e-1f);
    p = fma(f, p, 0.49999994f);
    p = fma(f * f, p, f) + 1.0f;
    return as_floatw(as_intw(p) + (as_intw(shifted) << 23));
}

/* 2^x for x <= 0, to 2e-7 (relative); about 0 below -125. The polynomial is a minimax fit of this project to 1.1e-7 on
 * |f| <= 1/2. */
static inline floatw exp2_negative(const floatw x)
{
    const float magic = 12582912.0f;
    const floatw y = max(x, -125.0f);
    const floatw shifted = y + magic;
    const floatw f = y - (shifted - magic);
    floatw p = fma(f, 1.3264653e-3f, 9.671511e-3f);
    p = fma(f, p, 5.550734e-2f);
    p = fma(f, p, 0.24022242f);
    p = fma(f, p, 0.693147f);
    p = fma(f, p, 1.0f);
    return as_floatw(as_intw(p) + (as_intw(shifted) << 23));
}

/* 1 - exp(-x) for x >= 0, given T = exp(-x): by its series where the difference would cancel. */
static inline floatw one_minus_exp(const floatw x, const floatw T)
{
    floatw p = fma(x, -1.9841270e-4f, 1.3888889e-3f);
    p = fma(x, p, -8.3333333e-3f);
    p = fma(x, p, 4.1666667e-2f);
    p = fma(x, p, -0.16666667f);
    p = fma(x, p, 0.5f);
    p = fma(x * x, -p, x);
    return SELECTW(x < 0.25f, p, 1.0f - T);
}
#endif
