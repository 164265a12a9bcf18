/* phase.h - phase functions. Mirrors reference_numpy/phase.py. */
#ifndef PHASE_H
#define PHASE_H
#include "vec.h"

/* Henyey and Greenstein 1941, of s2 = sin^2(theta/2) and c2 = cos^2(theta/2) [1/sr].
 * 1 + g^2 - 2 g cos(theta) is summed from two terms >= 0, so that g near +-1 loses no digits at the peak. */
inline floatw henyey_greenstein(const floatw s2, const floatw c2, const float g)
{
    const float one_minus = 1.0f - fabs(g);
    const floatw q = fma(4.0f * fabs(g), g > 0.0f ? s2 : c2, one_minus * one_minus);
    const floatw inv = rsqrt(q);
    return (1.0f - g) * (1.0f + g) * (0.25f * M_1_PI_F) * inv * inv * inv;
}
#endif
