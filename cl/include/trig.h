/* trig.h - arc tangent, sine and cosine by polynomial, on the ranges that the passes need.
 *
 * The built-in sin and atan2 of wide vectors run several times slower than the rest of a kernel; these are fused
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

/* sin(x) and cos(x), 0 <= x <= pi/2, by doubling the angle. */
static inline floatw sincos_quarter(const floatw x, floatw *cos_x)
{
    floatw c;
    const floatw s = sincos_eighth(0.5f * x, &c);
    *cos_x = fma(-2.0f * s, s, 1.0f);
    return 2.0f * s * c;
}

/* Angle of (x, y) for x, y >= 0, not both zero: 0 to pi/2; fit of atan on [0, 1] to 2e-8 (relative). */
static inline floatw atan2_quarter(const floatw y, const floatw x)
{
    const floatw t = fmin(y, x) / fmax(y, x);
    const floatw z = t * t;
    floatw p = fma(z, 2.9206697e-3f, -1.6367843e-2f);
    p = fma(z, p, 4.3211732e-2f);
    p = fma(z, p, -7.5522043e-2f);
    p = fma(z, p, 1.0666000e-1f);
    p = fma(z, p, -1.4211054e-1f);
    p = fma(z, p, 1.9993773e-1f);
    p = fma(z, p, -3.3333152e-1f);
    const floatw a = fma(t * z, p, t);
    return SELECTW(y > x, M_PI_2_F - a, a);
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

/* Angle of (x, y) for y >= 0, not both zero: 0 to pi. */
static inline floatw atan2_upper(const floatw y, const floatw x)
{
    const floatw a = atan2_quarter(y, fabs(x));
    return SELECTW(x < 0.0f, M_PI_F - a, a);
}
#endif
