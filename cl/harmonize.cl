/* harmonize.cl - fusion of ambient and local light. Mirrors reference_numpy/harmonize.py.
 * Paper, supp. "Environment Harmonization".
 */
#include "include/vec.h"

#define PAPER 1 /* convention */

__kernel void harmonize(
    __global float *rgb,
    __global const float *direct,
#ifdef LAYERS
    __global float *fusion_weight,
#endif
    const float strength,
    const float threshold,
    const int convention,
    const int pitch,
    const int plane)
{
    const int i = get_global_id(1) * pitch + W * get_global_id(0);
    const floatw r = LOADW(direct + i), g = LOADW(direct + i + plane), b = LOADW(direct + i + 2 * plane);
    const floatw mean = (r + g + b) * (1.0f / 3.0f);
    const floatw seen = convention == PAPER ? SELECTW(mean < threshold, 0.0f, mean) : fmax(mean - threshold, 0.0f);
    const floatw weight = clamp(strength * seen, 0.0f, 1.0f);
    const floatw keep = 1.0f - weight;
    const floatw lamps = convention == PAPER ? weight : (floatw)(1.0f);
    STOREW(fma(keep, LOADW(rgb + i), lamps * r), rgb + i);
    STOREW(fma(keep, LOADW(rgb + i + plane), lamps * g), rgb + i + plane);
    STOREW(fma(keep, LOADW(rgb + i + 2 * plane), lamps * b), rgb + i + 2 * plane);
#ifdef LAYERS
    STOREW(weight, fusion_weight + i);
#endif
}
