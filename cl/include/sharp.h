/* sharp.h - numbers of two floats: a float, and what it leaves out.
 *
 * That forbids the compiler to fuse a product into a sum: what was left out of the product would be counted twice.
 */
#ifndef SHARP_H
#define SHARP_H
#include "vec.h"

/* A number is hi + lo. */
typedef struct {
    floatw hi, lo;
} Sharp;

static inline Sharp sharp(const floatw x)
{
    const Sharp s = {x, 0.0f};
    return s;
}

/* a + b. Knuth's two-sum. */
static inline Sharp sharp_sum(const Sharp a, const Sharp b)
{
#pragma OPENCL FP_CONTRACT OFF
    Sharp s;
    s.hi = a.hi + b.hi;
    const floatw part = s.hi - a.hi;
    s.lo = ((a.hi - (s.hi - part)) + (b.hi - part)) + (a.lo + b.lo);
    return s;
}

/* The same number, as much of it as can be in hi: after a sum in which digits cancelled, lo is not small beside hi. */
static inline Sharp sharp_tidy(const Sharp a)
{
#pragma OPENCL FP_CONTRACT OFF
    Sharp s;
    s.hi = a.hi + a.lo;
    s.lo = a.lo - (s.hi - a.hi);
    return s;
}

/* a b for a number b + b_lo. */
static inline Sharp sharp_product(const Sharp a, const floatw b, const floatw b_lo)
{
#pragma OPENCL FP_CONTRACT OFF
    Sharp p;
    p.hi = a.hi * b;
    p.lo = fma(a.hi, b, -p.hi) + fma(a.lo, b, a.hi * b_lo);
    return p;
}

/* a / b. */
static inline Sharp sharp_quotient(const Sharp a, const Sharp b)
{
#pragma OPENCL FP_CONTRACT OFF
    Sharp q;
    q.hi = a.hi / b.hi;
    q.lo = (fma(-q.hi, b.hi, a.hi) + (a.lo - q.hi * b.lo)) / b.hi;
    return q;
}
#endif
