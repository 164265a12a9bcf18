/* overcast_sky.cl - the sky under clouds. Mirrors reference_numpy/overcast_sky.py.
 * Paper, supp. "Atmospheric Effects".
 */
#include "include/srgb.h"
#include "include/vec.h"

#define PAPER 1 /* convention */

__kernel void overcast_sky(
    __global float *rgb,
    __global const uchar *sky,
    const float3 tint,
    const float amount,
    const float desaturation,
    const int convention,
    const int pitch,
    const int plane)
{
    const int i = get_global_id(1) * pitch + W * get_global_id(0);
    const intw covered = LOADMASKW(sky + i);
    if (!ANYW(covered))
        return;
    const floatw r = LOADW(rgb + i), g = LOADW(rgb + i + plane), b = LOADW(rgb + i + 2 * plane);
    const floatw Y = luminance_of(r, g, b);
    const float tint_Y = fma(tint.x, LUMINANCE_R, fma(tint.y, LUMINANCE_G, tint.z * LUMINANCE_B));
    const floatw clouds = amount * (convention == PAPER ? (floatw)(1.0f) : Y / tint_Y); /* how much of the tint */
    const float keep = (1.0f - amount) * (1.0f - desaturation);
    const floatw grey = (1.0f - amount) * desaturation * Y;
    STOREW(SELECTW(covered, fma(keep, r, fma(clouds, tint.x, grey)), r), rgb + i);
    STOREW(SELECTW(covered, fma(keep, g, fma(clouds, tint.y, grey)), g), rgb + i + plane);
    STOREW(SELECTW(covered, fma(keep, b, fma(clouds, tint.z, grey)), b), rgb + i + 2 * plane);
}
