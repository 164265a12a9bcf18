/* gather.h - vectors of values from scattered places, at least four neighbouring values at a time: one load a lane. */
#ifndef GATHER_H
#define GATHER_H
#include "vec.h"

/* Asks for 16 floats before they are read. PoCL's `prefetch` does nothing; its CPUs have one space of addresses. */
#if W > 1 && defined(POCL_DEVICE_ADDRESS_BITS)
#define PREFETCH(p) __builtin_prefetch((const void *)(uintptr_t)(p))
#else
#define PREFETCH(p) prefetch(p, 16)
#endif

/* Four floats at each of W places. */
typedef struct {
    floatw x, y, z, w;
} Quad;

#if W == 1
#define TOINTW(x) convert_int(x)
INLINE Quad transposed(const float *restrict four)
{
    const Quad out = {four[0], four[1], four[2], four[3]};
    return out;
}

static inline void by_lanes(const Quad q, float *restrict four)
{
    vstore4((float4)(q.x, q.y, q.z, q.w), 0, four);
}
#else
#define TOINTW(x) JOIN(convert_int, W)(x)
/* Four values of each lane, lane after lane, turned into four vectors. The arrays never leave the registers; vectors put
 * together from shorter ones compile to the same, but make Oclgrind 21.10 crash when it looks for values that were never
 * set; and it takes the last of 16 for unset in a swizzle, so the fourths are named one by one. */
INLINE Quad transposed(const float *restrict four)
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

/* The other way: four vectors, lane after lane. */
static inline void by_lanes(const Quad q, float *restrict four)
{
    float x[W], y[W], z[W], w[W];
    STOREW(q.x, x);
    STOREW(q.y, y);
    STOREW(q.z, z);
    STOREW(q.w, w);
    #pragma unroll
    for (int k = 0; k < W / 4; k++) {
        float16 lanes;
        lanes.s048c = vload4(k, x);
        lanes.s159d = vload4(k, y);
        lanes.s26ae = vload4(k, z);
        lanes.s37bf = vload4(k, w);
        vstore16(lanes, k, four);
    }
}
#endif

/* Four values of each lane into a place of their own, `stride` floats from one to the next. */
static inline void spread(__global float *restrict p, const int stride, const Quad q)
{
    float four[4 * W];
    by_lanes(q, four);
    #pragma unroll
    for (int j = 0; j < W; j++)
        vstore4(vload4(j, four), 0, p + stride * j);
}

/* Four values of each lane, lane after lane. */
static inline void store_lanes(__global float *restrict p, const Quad q)
{
    float four[4 * W];
    by_lanes(q, four);
    for (int j = 0; j < W; j++)
        vstore4(vload4(j, four), j, p);
}

/* What `store_lanes` has put down. */
static inline Quad load_lanes(__global const float *restrict p)
{
    float four[4 * W];
    for (int j = 0; j < W; j++)
        vstore4(vload4(j, p), j, four);
    return transposed(four);
}

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
