/* capsules.h - where particles are and how they show. Mirrors reference_numpy/capsules.py.
 *
 * Places in the picture keep what a float leaves out: a soft edge shows hundred-thousandths of a pixel.
 */
#ifndef CAPSULES_H
#define CAPSULES_H
#include "gather.h"
#include "noise.h"
#include "ramps.h"
#include "sharp.h"
#include "vec.h"

#define PAPER 1          /* convention */
#define CLASSES 1024
#define SOFT_PX 1.4f
#define DISC 5.0f
#define BLUR 3.0f
#define ACROSS (256.0f / 315.0f)
#define AROUND (0.2f * M_PI_F)
#define FADE_NEAR 0.5f
#define FADE_FAR 0.36f

/* What a pass is told of its particles; see `particle_arguments` in aw4d/world/falling.py. */
typedef struct {
    int count;
    uint seed;
    __global const uint *at;
    __global const int *corner;
    __global const float *axes, *move, *bounds;
    float taper;
    float fx, fy, cx, cy;
    int width, height;
    float near_m, reach_m, opacity, aperture_mm, focus_m;
    int convention;
} Falling;

/* A vector of particles as they show. */
typedef struct {
    floatw x, y, z;                  /* [m] camera frame; z is the depth by which they are sorted */
    Sharp head_u, head_v, tail_u, tail_v; /* [px] */
    floatw head_radius, tail_radius, length; /* [px] */
    floatw opacity, covers;
} Capsule;

static inline Sharp sharp_difference(const Sharp a, const Sharp b)
{
    const Sharp minus = {-b.hi, -b.lo};
    return sharp_tidy(sharp_sum(a, minus));
}

static inline Sharp sharp_square(const Sharp a)
{
#pragma OPENCL FP_CONTRACT OFF
    Sharp s;
    s.hi = a.hi * a.hi;
    s.lo = fma(a.hi, a.hi, -s.hi) + 2.0f * a.hi * a.lo;
    return s;
}

/* All 31 bits of an integer and its sign. */
static inline Sharp sharp_integer(const intw i)
{
    const Sharp s = {FLOATW(i >> 8) * 256.0f, FLOATW(i & 255)};
    return s;
}

/* Whole numbers at each of W places. */
static inline uintw pick(__global const uint *restrict p, const intw i)
{
    int at[W];
    uint picked[W];
    STOREW(i, at);
    for (int j = 0; j < W; j++)
        picked[j] = p[at[j]];
    return LOADW(picked);
}

/* One coordinate of places in their boxes, in units, as seen from the eye; `at`: how far their classes have moved. */
static inline intw in_box(const Falling f, const intw i, const uintw at, const int axis)
{
    const uintw drawn = hash2(i, hash_row((intw)(axis), f.seed)) >> 1;
    return as_intw((drawn + at) & 0x7FFFFFFFu) + f.corner[axis];
}

/* The same of W particles from i0 on, which are of W classes in order, rounded. */
static inline floatw near_in_box(const Falling f, const int i0, const int axis)
{
    return FLOATW(in_box(f, i0 + INTW(LANES), LOADW(f.at + axis * CLASSES + (i0 & (CLASSES - 1))), axis));
}

static inline Sharp along_row(const Sharp a, const Sharp b, const Sharp c, __global const float *restrict row)
{
    const Sharp ab = sharp_sum(sharp_product(a, row[0], 0.0f), sharp_product(b, row[1], 0.0f));
    return sharp_tidy(sharp_sum(ab, sharp_product(c, row[2], 0.0f)));
}

/* Pixel of a point. */
static inline Sharp pixel(const Sharp x, const Sharp z, const float f, const float c)
{
    return sharp_sum(sharp_product(sharp_quotient(x, z), f, 0.0f), sharp((floatw)(c)));
}

/* Radius at which an end of a capsule fades out [px]. */
static inline floatw soft_radius(const floatw radius, const floatw blur)
{
    return sqrt(fma(DISC * radius, radius, fma(BLUR * blur, blur, (floatw)(SOFT_PX * SOFT_PX))));
}

/* Particles of some numbers as they show. */
static inline Capsule capsule(const Falling f, const intw i)
{
    Capsule c;
    const intw kind = i & (CLASSES - 1);
    const Quad move = gather(f.move, 2 * kind);
    const floatw scale = gather(f.move, 2 * kind + 1).x;
    const Sharp bx = sharp_integer(in_box(f, i, pick(f.at, kind), 0));
    const Sharp by = sharp_integer(in_box(f, i, pick(f.at + CLASSES, kind), 1));
    const Sharp bz = sharp_integer(in_box(f, i, pick(f.at + 2 * CLASSES, kind), 2));
    const Sharp x = along_row(bx, by, bz, f.axes), y = along_row(bx, by, bz, f.axes + 3);
    Sharp z = along_row(bx, by, bz, f.axes + 6);
    const intw ahead = z.hi > 0.0f;
    z.hi = SELECTW(ahead, z.hi, 1.0f);
    z.lo = SELECTW(ahead, z.lo, 0.0f);

    const Sharp half_z = {0.5f * z.hi, 0.5f * z.lo};
    Sharp kept = sharp_quotient(half_z, sharp(fmax(fabs(move.z), 1e-30f)));
    const intw all = kept.hi >= 1.0f;
    kept.hi = SELECTW(all, 1.0f, kept.hi);
    kept.lo = SELECTW(all, 0.0f, kept.lo);
    const Sharp hx = sharp_product(kept, move.x, 0.0f), hy = sharp_product(kept, move.y, 0.0f);
    const Sharp hz = sharp_product(kept, move.z, 0.0f);
    const Sharp head_z = sharp_sum(z, hz), tail_z = sharp_difference(z, hz);
    c.head_u = pixel(sharp_sum(x, hx), head_z, f.fx, f.cx);
    c.head_v = pixel(sharp_sum(y, hy), head_z, f.fy, f.cy);
    c.tail_u = pixel(sharp_difference(x, hx), tail_z, f.fx, f.cx);
    c.tail_v = pixel(sharp_difference(y, hy), tail_z, f.fy, f.cy);

    const float focal = 0.5f * (f.fx + f.fy);
    const floatw blur = focal * f.aperture_mm * 5e-4f * fabs(1.0f / (scale * z.hi) - 1.0f / f.focus_m);
    const floatw size = 0.5f * focal * move.w, r = size / z.hi;
    const floatw r_head = size / head_z.hi, r_tail = size / tail_z.hi * f.taper;
    c.head_radius = soft_radius(r_head, blur);
    c.tail_radius = soft_radius(r_tail, blur);
    const floatw du = sharp_difference(c.head_u, c.tail_u).hi, dv = sharp_difference(c.head_v, c.tail_v).hi;
    c.length = sqrt(fma(du, du, dv * dv));
    const floatw both = c.head_radius + c.tail_radius;
    const floatw around = fma(c.head_radius, c.head_radius, c.tail_radius * c.tail_radius);
    const floatw drawn = fma(0.5f * ACROSS * both, c.length, 0.5f * AROUND * around);
    const floatw seen = f.convention == PAPER
        ? fma(r_head + r_tail, c.length, 0.5f * M_PI_F * fma(r_head, r_head, r_tail * r_tail))
        : M_PI_F * r * r * kept.hi;

    const Sharp depth = sharp_product(z, scale, 0.0f);
    c.x = scale * x.hi;
    c.y = scale * y.hi;
    c.z = depth.hi + depth.lo;
    const Sharp d2 = sharp_sum(sharp_sum(sharp_square(x), sharp_square(y)), sharp_square(z));
    const Sharp reach2 = sharp_square(sharp((floatw)(f.reach_m)));
    const floatw past_near = (depth.hi - f.near_m) + depth.lo, to_reach = sharp_difference(reach2, d2).hi;
    const floatw fade = smooth_ramp(past_near / (FADE_NEAR * f.near_m)) * smooth_ramp(to_reach / (FADE_FAR * reach2.hi));
    c.opacity = SELECTW(ahead & (i < f.count), fmin(f.opacity * seen / drawn, 1.0f) * fade, 0.0f);
    c.covers = fmin(1.0f, 4.0f * r / both) * fade;
    return c;
}

/* The pixels that a particle may reach: of columns or of rows. */
static inline intw first_pixel(const Sharp head, const Sharp tail, const floatw wide)
{
    return INTW(clamp(floor(fmin(head.hi, tail.hi) - wide), -1e6f, 1e6f));
}

static inline intw last_pixel(const Sharp head, const Sharp tail, const floatw wide)
{
    return INTW(clamp(ceil(fmax(head.hi, tail.hi) + wide), -1e6f, 1e6f));
}

/* Which particles show. */
static inline intw in_front(const Falling f, const Capsule c)
{
    const floatw wide = fmax(c.head_radius, c.tail_radius);
    return (c.opacity > 0.0f)
        & (last_pixel(c.head_u, c.tail_u, wide) >= 0) & (first_pixel(c.head_u, c.tail_u, wide) < f.width)
        & (last_pixel(c.head_v, c.tail_v, wide) >= 0) & (first_pixel(c.head_v, c.tail_v, wide) < f.height);
}

/* Where the middles of particles lie that may show: z > -room, |f x + (c - middle) z| < wide z + margin, by columns or by
 * rows. */
typedef struct {
    float off, wide, margin;
} View;

/* Of `size` pixels. A particle's ends are no farther than `way` from its middle, and no nearer than half of its depth. */
static inline View view(const Falling f, const float focal, const float c, const int size, const float way)
{
    const float mean = 0.5f * (f.fx + f.fy), blur = sqrt(BLUR) * mean * f.aperture_mm * 5e-4f;
    const float most = 1.5f * (sqrt(DISC) * mean * f.bounds[1] * fmax(f.taper, 1.0f) + blur / f.bounds[2]); /* [px m] */
    View v;
    v.off = c - 0.5f * (size - 1);
    v.wide = 0.5f * (size + 1) + SOFT_PX + blur / f.focus_m + 1.0f;
    v.margin = (focal + fabs(v.off) + v.wide) * way + most;
    return v;
}

/* Which of W particles from i0 on may show, by their rounded places: for most it is a few times cheaper to know that they
 * do not. */
static inline intw may_show(const Falling f, const View across, const View down, const float room, const int i0)
{
    __global const float *a = f.axes;
    const floatw bx = near_in_box(f, i0, 0), by = near_in_box(f, i0, 1), bz = near_in_box(f, i0, 2);
    const floatw x = fma(bx, a[0], fma(by, a[1], bz * a[2]));
    const floatw y = fma(bx, a[3], fma(by, a[4], bz * a[5]));
    const floatw z = fma(bx, a[6], fma(by, a[7], bz * a[8]));
    const float reach = f.reach_m + room;
    return (z > -room) & (fma(x, x, fma(y, y, z * z)) < reach * reach)
        & (fabs(fma(f.fx, x, across.off * z)) < fma(across.wide, z, across.margin))
        & (fabs(fma(f.fy, y, down.off * z)) < fma(down.wide, z, down.margin))
        & (i0 + INTW(LANES) < f.count);
}
#endif
