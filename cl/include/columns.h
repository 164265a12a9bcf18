/* columns.h - pixels of a row in pairs, side by side, from columns that vary from lane to lane. */
#ifndef COLUMNS_H
#define COLUMNS_H
#include "vec.h"

#define NEXT (2 * W)     /* [px] from what a work-item reads to what the next one in the row adds to it, a cache line or less */

/* Columns of a row, most often side by side. */
typedef struct {
    int first;                   /* [px] a lane's is this, its number, */
    intw off;                    /* [px] and so many more */
    int most;                    /* [px] which are no more than that to either side; 2: any number */
} Place;

/* Values of two pixels side by side. */
typedef struct {
    floatw left, right;
} Pair;

#if W == 1
#define LAST(x) (x)
#define NUMBERS 0
INLINE Pair pick(__global const float *restrict p, const Place *at)
{
    const Pair s = {p[at->first + at->off], p[at->first + at->off + 1]};
    return s;
}
#else
#if W == 4
#define LAST(x) (x).s3
#define NUMBERS ((intw)(0, 1, 2, 3))
#elif W == 8
#define LAST(x) (x).s7
#define NUMBERS ((intw)(0, 1, 2, 3, 4, 5, 6, 7))
#else
#define LAST(x) (x).sf
#define NUMBERS ((intw)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#endif
/* On level ground columns all but always lie side by side; ripples tilt it a column to either side of that. Else four lanes
 * at a time, as in gather.h. */
INLINE Pair pick(__global const float *restrict p, const Place *at)
{
    Pair s;
    __global const float *restrict q = p + at->first;
    if (at->most == 0) {
        s.left = LOADW(q);
        s.right = LOADW(q + 1);
        return s;
    }
    if (at->most == 1) {
        const floatw a = LOADW(q - 1), b = LOADW(q), c = LOADW(q + 1), d = LOADW(q + 2);
        s.left = SELECTW(at->off < 0, a, SELECTW(at->off > 0, c, b));
        s.right = SELECTW(at->off < 0, b, SELECTW(at->off > 0, d, c));
        return s;
    }
    int from[W];
    float two[8], left[W], right[W];
    STOREW(at->off + at->first + NUMBERS, from);
    #pragma unroll
    for (int k = 0; k < W / 4; k++) {
        #pragma unroll
        for (int j = 0; j < 4; j++)
            vstore2(vload2(0, p + from[4 * k + j]), j, two);
        const float8 t = vload8(0, two);
        vstore4(t.even, k, left);
        vstore4(t.odd, k, right);
    }
    s.left = LOADW(left);
    s.right = LOADW(right);
    return s;
}
#endif
#endif
