/* phase.h - phase functions. Mirrors reference_numpy/phase.py. */
#ifndef PHASE_H
#define PHASE_H
#include "vec.h"

/* q^1.5 of Henyey and Greenstein 1941, p = phase_scale(g) / q^1.5, q = 1 + g^2 - 2 g cos(theta), of the sine and cosine of
 * theta/2: summed from two terms >= 0, so that g near +-1 loses no digits at the peak. */
static inline floatw phase_q15(const floatw s, const floatw c, const float g)
{
    const float one_minus = 1.0f - fabs(g);
    const floatw h = g > 0.0f ? s : c;
    const floatw q = fma(4.0f * fabs(g) * h, h, one_minus * one_minus);
    return q * sqrt(q);
}

static inline float phase_scale(const float g) /* [1/sr] */
{
    return (1.0f - g) * (1.0f + g) * (0.25f * M_1_PI_F);
}

/* Phase function of mu, the cosine of the scattering angle [1/sr]. */
static inline floatw henyey_greenstein(const floatw mu, const float g)
{
    return phase_scale(g) / phase_q15(sqrt(fmax(0.5f - 0.5f * mu, 0.0f)), sqrt(fmax(0.5f + 0.5f * mu, 0.0f)), g);
}
#endif
