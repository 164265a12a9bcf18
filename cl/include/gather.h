/* gather.h - vectors of values from scattered places, at least four neighbouring values at a time: one load a lane. */
#ifndef GATHER_H
#define GATHER_H
#include "vec.h"

/* Four floats at each of W places. */
typedef struct {
    floatw x, y, z, w;
} Quad;

#if W == 1
#define TOINTW(x) convert_int(x)
static inline Quad transposed(const float *restrict four)
{
    const Quad out = {four[0], four[1], four[2], four[3]};
    return out;
}
#else
#define TOINTW(x) JOIN(convert_int, W)(x)
/* Four values of each lane, lane after lane, turned into four vectors. The arrays never leave the registers; vectors put
 * together from shorter ones compile to the same, but make Oclgrind 21.10 crash when it looks for values that were never
 * set; and it takes the last of 16 for unset in a swizzle, so the fourths are named one by one. */
static inline Quad transposed(const float *restrict four)
{
    float x[W], y[W], z[W], w[W];
    #pragma unroll
    for (int k = 0; k < W / 4; k++) {
        const float16 q = vload16(k, four);
        vstore4(q.s048c, k, x);
        vstore4(q.s159d, k, y);
        vstore4(q.s26ae, k, z);
        vstore4((float4)(q.s3, q.s7, q.sb, q.sf), k, w);
    }
    const Quad out = {LOADW(x), LOADW(y), LOADW(z), LOADW(w)};
    return out;
}
#endif

static inline Quad gather(__global const float *restrict p, const intw i)
{
    int at[W];
    float four[4 * W];
    STOREW(i, at);
    for (int j = 0; j < W; j++)
        vstore4(vload4(at[j], p), j, four);
    return transposed(four);
}
#endif
