/* srgb8.cl - the picture as it is shown and stored. Mirrors reference_numpy/srgb8.py. */
#include "include/srgb.h"
#include "include/vec.h"

#if W == 1
#define BYTEW(x) convert_uchar(x)
#else
#define BYTEW(x) JOIN(convert_uchar, W)(x)
#endif

__kernel void srgb8(__global const float *rgb, __global uchar *image, const int pitch, const int plane)
{
    const int i = get_global_id(1) * pitch + W * get_global_id(0);
    for (int c = 0; c < 3; c++) {
        const floatw code = srgb_encode(clamp(LOADW(rgb + i + c * plane), 0.0f, 1.0f));
        STOREW(BYTEW(INTW(fma(255.0f, code, 0.5f))), image + i + c * plane);
    }
}
