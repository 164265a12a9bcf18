/* trig.h - sine and cosine by polynomial, on the range that the passes need.
 *
 * The built-in sin of wide vectors runs several times slower than the rest of a kernel; these are fused
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
#endif
