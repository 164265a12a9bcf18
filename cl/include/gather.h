/* gather.h - vectors of values from scattered places, four neighbouring values at a time: one load a lane. */
#ifndef GATHER_H
#define GATHER_H
#include "vec.h"

/* Four floats at each of W places. */
typedef struct {
    floatw x, y, z, w;
} Quad;

#if W == 1
#define TOINTW(x) convert_int(x)
static inline Quad gather(__global const float *restrict p, const int i)
{
    const float4 q = vload4(i, p);
    const Quad out = {q.x, q.y, q.z, q.w};
    return out;
}
#else
#define TOINTW(x) JOIN(convert_int, W)(x)
/* Loads of four lanes, turned into four vectors of four. The arrays never leave the registers; vectors put together from
 * shorter ones compile to the same, but make Oclgrind 21.10 crash when it looks for values that were never set; and it
 * takes the last of 16 for unset in a swizzle, so the fourths are named one by one. */
static inline Quad gather(__global const float *restrict p, const intw i)
{
    int at[W];
    float four[16], x[W], y[W], z[W], w[W];
    JOIN(vstore, W)(i, 0, at);
    for (int k = 0; k < W / 4; k++) {
        for (int j = 0; j < 4; j++)
            vstore4(vload4(at[4 * k + j], p), j, four);
        const float16 q = vload16(0, four);
        vstore4(q.s048c, k, x);
        vstore4(q.s159d, k, y);
        vstore4(q.s26ae, k, z);
        vstore4((float4)(q.s3, q.s7, q.sb, q.sf), k, w);
    }
    const Quad out = {JOIN(vload, W)(0, x), JOIN(vload, W)(0, y), JOIN(vload, W)(0, z), JOIN(vload, W)(0, w)};
    return out;
}
#endif
#endif
