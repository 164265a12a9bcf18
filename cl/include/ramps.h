/* ramps.h - from 0 to 1 without a kink. Mirrors reference_numpy/ramps.py. */
#ifndef RAMPS_H
#define RAMPS_H
#include "vec.h"

/* 0 to 1, level at both ends, for t from 0 to 1. */
static inline floatw smooth_ramp(const floatw t)
{
    const floatw s = clamp(t, 0.0f, 1.0f);
    return s * s * fma(-2.0f, s, (floatw)3.0f);
}
#endif
