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
static inline float16 gather_four(__global const float *restrict p, const int4 i)
{
    return (float16)(vload4(i.x, p), vload4(i.y, p), vload4(i.z, p), vload4(i.w, p));
}
#if W == 4
static inline Quad gather(__global const float *restrict p, const int4 i)
{
    const float16 a = gather_four(p, i);
    const Quad out = {a.s048c, a.s159d, a.s26ae, a.s37bf};
    return out;
}
#elif W == 8
static inline Quad gather(__global const float *restrict p, const int8 i)
{
    const float16 a = gather_four(p, i.lo), b = gather_four(p, i.hi);
    const Quad out = {
        (float8)(a.s048c, b.s048c), (float8)(a.s159d, b.s159d), (float8)(a.s26ae, b.s26ae), (float8)(a.s37bf, b.s37bf)};
    return out;
}
#else
static inline Quad gather(__global const float *restrict p, const int16 i)
{
    const float16 a = gather_four(p, i.s0123), b = gather_four(p, i.s4567);
    const float16 c = gather_four(p, i.s89ab), d = gather_four(p, i.scdef);
    const Quad out = {
        (float16)(a.s048c, b.s048c, c.s048c, d.s048c), (float16)(a.s159d, b.s159d, c.s159d, d.s159d),
        (float16)(a.s26ae, b.s26ae, c.s26ae, d.s26ae), (float16)(a.s37bf, b.s37bf, c.s37bf, d.s37bf)};
    return out;
}
#endif
#endif
#endif
