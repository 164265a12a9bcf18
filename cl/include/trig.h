/* trig.h - arc cosine, sine and cosine by polynomial, on the ranges that the passes need.
 *
 * The built-in sin and acos of wide vectors run several times slower than the rest of a kernel; these are fused
 * multiply-adds. Coefficients: minimax fits of this project (Lawson's reweighted least squares), error of the fit stated.
 */
#ifndef TRIG_H
#define TRIG_H
#include "vec.h"

/* sin(x) and cos(x), 0 <= x <= pi/4; fits to 4e-9 (relative) and 7e-11. */
static inline floatw sincos_eighth(const floatw x, floatw *cos_x)
{
    const floatw z = x * x;
    *cos_x = fma(z, fma(z, fma(z, fma(z, 2.4383568e-5f, -1.3886682e-3f), 4.1666619e-2f), -0.5f), 1.0f);
    return fma(x * z, fma(z, fma(z, -1.9515282e-4f, 8.3321603e-3f), -1.6666655e-1f), x);
}

/* Arc cosine, 0 <= x <= 1; fit of acos(x) / sqrt(1 - x) to 1.5e-8 (relative). */
static inline floatw acos_quarter(const floatw x)
{
    floatw p = fma(x, -1.25345693e-3f, 6.63861869e-3f);
    p = fma(x, p, -1.70451038e-2f);
    p = fma(x, p, 3.08627538e-2f);
    p = fma(x, p, -5.01641898e-2f);
    p = fma(x, p, 8.89773126e-2f);
    p = fma(x, p, -0.214598697f);
    p = fma(x, p, 1.5707963f);
    const floatw y = 1.0f - x;
    return sqrt(y) * p;
}

/* Arc cosine, -1 <= x <= 1. */
static inline floatw acos_upper(const floatw x)
{
    const floatw a = acos_quarter(fabs(x));
    return SELECTW(x < 0.0f, M_PI_F - a, a);
}
#endif
