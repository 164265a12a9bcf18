/* particles.h - what falls through the air: where particles are, how they show, their order, how they are blended.
 * Mirrors reference_numpy/particles.py.
 *
 * Ten stages, none of which waits for the host: `keys` gives every particle that shows its step of depth; these are
 * sorted, stably, by two digits, of which each is counted in chunks, summed up, and spread; `records` puts what is drawn
 * of each particle in their order; `bins` says in which columns and rows of tiles it shows, a bit a particle; the last
 * walks over the bits that a tile's column and row share. All are as long as they must be for any number of particles.
 *
 * Places in the picture keep what a float leaves out: a soft edge shows hundred-thousandths of a pixel.
 */
#ifndef PARTICLES_H
#define PARTICLES_H
#include "environment.h"
#include "exp.h"
#include "lamp.h"
#include "noise.h"
#include "phase.h"
#include "ramps.h"
#include "sharp.h"
#include "vec.h"
#include "world.h"

#define PAPER 1          /* convention */
#define CLASSES 1024
#define KEYS 65536
#define NONE 0xFFFFFFFFu /* key of what does not show */
#define WORD 64          /* particles a word of bits */
#define SOFT_PX 1.4f
#define DISC 5.0f
#define BLUR 3.0f
#define ACROSS (256.0f / 315.0f)
#define AROUND (0.2f * M_PI_F)
#define FADE_NEAR 0.5f
#define FADE_FAR 0.36f
#define BEHIND 0.01f
#define COVERED 4.0f

/* Given at build time: CHUNKS of particles that are counted together, DIGITS of a sort, RECORD floats a particle. */

/* What a pass is told of its particles; see `particle_arguments` in aw4d/world/falling.py. */
typedef struct {
    int count;
    uint seed;
    __global const uint *at;
    __global const int *corner;
    __global const float *axes, *move;
    float steps, taper;
    float fx, fy, cx, cy;
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

/* One coordinate of places in their boxes, in units, as seen from the eye. */
static inline Sharp in_box(const Falling f, const intw i, const floatw at, const int axis)
{
    const uintw drawn = hash2(i, hash_row((intw)(axis), f.seed)) >> 1;
    return sharp_integer(as_intw((drawn + as_uintw(at)) & 0x7FFFFFFFu) + f.corner[axis]);
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

static inline Capsule capsule(const Falling f, const intw i)
{
    Capsule c;
    const intw kind = i & (CLASSES - 1);
    const Quad at = gather((__global const float *)f.at, kind);
    const Quad move = gather(f.move, 2 * kind);
    const floatw scale = gather(f.move, 2 * kind + 1).x;
    const Sharp bx = in_box(f, i, at.x, 0), by = in_box(f, i, at.y, 1), bz = in_box(f, i, at.z, 2);
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
    const Sharp hx = sharp_product(kept, move.x, 0.0f), hy = sharp_product(kept, move.y, 0.0f), hz = sharp_product(kept, move.z, 0.0f);
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

/* Keys of W particles from i0 on. */
static inline void particle_keys(
    const Falling f, const int i0, const int width, const int height, __global uint *restrict key)
{
    const Capsule c = capsule(f, i0 + INTW(LANES));
    const floatw wide = fmax(c.head_radius, c.tail_radius);
    const intw shows = (c.opacity > 0.0f)
        & (last_pixel(c.head_u, c.tail_u, wide) >= 0) & (first_pixel(c.head_u, c.tail_u, wide) < width)
        & (last_pixel(c.head_v, c.tail_v, wide) >= 0) & (first_pixel(c.head_v, c.tail_v, wide) < height);
    const intw step = INTW(clamp(c.z * f.steps, 0.0f, (float)(KEYS - 1)));
    int found[W], some[W];
    STOREW(step, found);
    STOREW(shows, some);
    for (int j = 0; j < min(W, f.count - i0); j++)
        key[i0 + j] = some[j] ? (uint)found[j] : NONE;
}

/* Where a chunk of n things begins. */
static inline int chunk_begin(const int n, const int chunk)
{
    return n / CHUNKS * chunk + min(chunk, n % CHUNKS);
}

/* Counts a digit of the keys of a chunk; particles that do not show have none. `order`: theirs so far, or 0. */
static inline void count_digit(
    __global const uint *key, __global const uint *order, const int n, const int shift, const int chunk,
    __global int *counts)
{
    for (int d = 0; d < DIGITS; d++)
        counts[d * CHUNKS + chunk] = 0;
    for (int j = chunk_begin(n, chunk); j < chunk_begin(n, chunk + 1); j++) {
        const uint k = key[order ? order[j] : (uint)j];
        if (k != NONE)
            counts[(k >> shift & (DIGITS - 1)) * CHUNKS + chunk]++;
    }
}

/* Turns counts into the places where each chunk's particles of each digit begin; their sum is how many show. */
static inline void sum_counts(__global int *counts, __global int *shown)
{
    int sum = 0;
    for (int k = 0; k < DIGITS * CHUNKS; k++) {
        const int here = counts[k];
        counts[k] = sum;
        sum += here;
    }
    *shown = sum;
}

/* Puts the particles of a chunk in the order of a digit. */
static inline void spread_digit(
    __global const uint *key, __global const uint *order, const int n, const int shift, const int chunk,
    __global int *counts, __global uint *sorted)
{
    for (int j = chunk_begin(n, chunk); j < chunk_begin(n, chunk + 1); j++) {
        const uint i = order ? order[j] : (uint)j, k = key[i];
        if (k != NONE)
            sorted[counts[(k >> shift & (DIGITS - 1)) * CHUNKS + chunk]++] = i;
    }
}

/* The light that meets particles. */
typedef struct {
    int count;
    __global const int *kind;
    __global const float *position, *direction, *intensity, *shape;
    __global const float *rotation, *specular;
    int levels, size;
    __global const float *sun_direction, *sun_irradiance;
    float lobe, g;
    float haze;
    __global const float *haze_color;
} Light;

typedef struct {
    floatw x, y, z;
} Triple;

/* Phase function of light that comes from the direction l and goes on to the eye against the ray v, both unit. */
static inline floatw turned(const Triple v, const floatw lx, const floatw ly, const floatw lz, const float g)
{
    const floatw ax = v.x - lx, ay = v.y - ly, az = v.z - lz;
    const floatw bx = v.x + lx, by = v.y + ly, bz = v.z + lz;
    const floatw s = 0.5f * sqrt(fma(ax, ax, fma(ay, ay, az * az)));
    const floatw c = 0.5f * sqrt(fma(bx, bx, fma(by, by, bz * bz)));
    return phase_scale(g) / phase_q15(s, c, g);
}

/* What of a lamp's intensity reaches the eye by particles at (x, y, z), seen along v. */
static inline floatw by_lamp(const Light by, const int l, const floatw x, const floatw y, const floatw z, const Triple v)
{
    __global const float *d = by.direction + 3 * l, *p = by.position + 3 * l, *shape = by.shape + 4 * l;
    if (by.kind[l] == DIRECTIONAL)
        return turned(v, (floatw)(-d[0]), (floatw)(-d[1]), (floatw)(-d[2]), by.g);
    const floatw px = p[0] - x, py = p[1] - y, pz = p[2] - z;
    const floatw d2 = fma(px, px, fma(py, py, pz * pz));
    floatw light = window(1.0f - d2 * (shape[3] * shape[3]));
    if (!ANYW(light > 0.0f))
        return 0.0f;
    const floatw inv = 1.0f / sqrt(fmax(d2, 1e-18f));
    const floatw lx = px * inv, ly = py * inv, lz = pz * inv;
    if (shape[0] >= 0.0f)
        light *= cone((-fma(lx, d[0], fma(ly, d[1], lz * d[2])) - shape[0]) * shape[2]);
    return light / (d2 + EPSILON) * turned(v, lx, ly, lz, by.g);
}

/* Radiance of particles at (x, y, z), through the haze. */
static inline Triple particle_color(const Light by, const floatw x, const floatw y, const floatw z)
{
    const floatw distance = sqrt(fma(x, x, fma(y, y, z * z))), inv = 1.0f / fmax(distance, 1e-9f);
    const Triple v = {x * inv, y * inv, z * inv};
    floatw X, Y, Z;
    to_world(by.rotation, v.x, v.y, v.z, &X, &Y, &Z);
    const Quad around = prefiltered(by.specular, by.levels, by.size, X, Y, Z, (floatw)(by.lobe));
    __global const float *s = by.sun_direction;
    const floatw sun = turned(v, (floatw)(s[0]), (floatw)(s[1]), (floatw)(s[2]), by.g);
    Triple c;
    c.x = fma(sun, by.sun_irradiance[0], around.x);
    c.y = fma(sun, by.sun_irradiance[1], around.y);
    c.z = fma(sun, by.sun_irradiance[2], around.z);
    for (int l = 0; l < by.count; l++) {
        const floatw falls = by_lamp(by, l, x, y, z, v);
        __global const float *intensity = by.intensity + 3 * l;
        c.x = fma(falls, intensity[0], c.x);
        c.y = fma(falls, intensity[1], c.y);
        c.z = fma(falls, intensity[2], c.z);
    }
    const floatw tau = by.haze * distance, T = exp_negative(-tau), haze = one_minus_exp(tau, T);
    c.x = fma(T, c.x, haze * by.haze_color[0]);
    c.y = fma(T, c.y, haze * by.haze_color[1]);
    c.z = fma(T, c.z, haze * by.haze_color[2]);
    return c;
}

/* Fields of a record. The axis runs along the major coordinate m, columns or rows, in which it is longer; the minor one
 * is n = n0 + k (m - m0). */
enum {
    M0, N0, HEAD_M, TAIL_M0, TAIL_M, SLOPE, SLOPE_LO, OFFSET, /* whole pixels, and what is left of them, of the ends */
    COSINE, STRETCH, SHEAR, INV_LENGTH,                       /* of the axis to m; signed by the way to the tail */
    RADIUS, GROWS, OPACITY, COVERS, DEPTH, RED, GREEN, BLUE,
    STEEP, LEFT, RIGHT, TOP, BOTTOM
};

/* Stores a field of W records, of which `left` are there. */
static inline void put(__global float *restrict record, const int left, const int field, const floatw values)
{
    float v[W];
    STOREW(values, v);
    for (int j = 0; j < min(W, left); j++)
        record[RECORD * j + field] = v[j];
}

/* Records of W particles in order, from j0 on. */
static inline void particle_records(
    const Falling f, const Light by, const int j0, const int shown, const int width, const int height,
    __global const uint *restrict order, __global float *restrict records)
{
    int held[W];
    for (int j = 0; j < W; j++)
        held[j] = order[min(j0 + j, shown - 1)];
    const Capsule c = capsule(f, LOADW(held));
    __global float *out = records + (size_t)RECORD * j0;
    const int left = shown - j0;

    const floatw du = sharp_difference(c.tail_u, c.head_u).hi, dv = sharp_difference(c.tail_v, c.head_v).hi;
    const intw steep = fabs(dv) >= fabs(du);
    const Sharp head_m = {SELECTW(steep, c.head_v.hi, c.head_u.hi), SELECTW(steep, c.head_v.lo, c.head_u.lo)};
    const Sharp head_n = {SELECTW(steep, c.head_u.hi, c.head_v.hi), SELECTW(steep, c.head_u.lo, c.head_v.lo)};
    const Sharp tail_m = {SELECTW(steep, c.tail_v.hi, c.tail_u.hi), SELECTW(steep, c.tail_v.lo, c.tail_u.lo)};
    const Sharp tail_n = {SELECTW(steep, c.tail_u.hi, c.tail_v.hi), SELECTW(steep, c.tail_u.lo, c.tail_v.lo)};
    Sharp dm = sharp_difference(tail_m, head_m);
    const intw point = dm.hi == 0.0f;
    dm.hi = SELECTW(point, 1.0f, dm.hi);
    Sharp k = sharp_quotient(sharp_difference(tail_n, head_n), dm);
    k.hi = SELECTW(point, 0.0f, k.hi);
    k.lo = SELECTW(point, 0.0f, k.lo);
    const floatw m0 = floor(head_m.hi), n0 = floor(head_n.hi), t0 = floor(tail_m.hi);
    const floatw m = (head_m.hi - m0) + head_m.lo, n = (head_n.hi - n0) + head_n.lo;
    const floatw cosine = 1.0f / sqrt(fma(k.hi, k.hi, (floatw)(1.0f)));
    const floatw sign = copysign((floatw)(1.0f), dm.hi);
    put(out, left, M0, m0);
    put(out, left, N0, n0);
    put(out, left, HEAD_M, m);
    put(out, left, TAIL_M0, t0);
    put(out, left, TAIL_M, (tail_m.hi - t0) + tail_m.lo);
    put(out, left, SLOPE, k.hi);
    put(out, left, SLOPE_LO, k.lo);
    put(out, left, OFFSET, fma(-k.hi, m, n));
    put(out, left, COSINE, cosine);
    put(out, left, STRETCH, sign * fma(k.hi * k.hi, cosine, cosine));
    put(out, left, SHEAR, sign * k.hi * cosine);
    put(out, left, INV_LENGTH, 1.0f / fmax(c.length, 1e-30f));
    put(out, left, RADIUS, c.head_radius);
    put(out, left, GROWS, c.tail_radius - c.head_radius);
    put(out, left, OPACITY, c.opacity);
    put(out, left, COVERS, c.covers);
    put(out, left, DEPTH, c.z);
    put(out, left, STEEP, SELECTW(steep, 1.0f, 0.0f));

    const Triple color = particle_color(by, c.x, c.y, c.z);
    put(out, left, RED, color.x);
    put(out, left, GREEN, color.y);
    put(out, left, BLUE, color.z);

    const floatw wide = fmax(c.head_radius, c.tail_radius);
    put(out, left, LEFT, FLOATW(max(first_pixel(c.head_u, c.tail_u, wide), 0)));
    put(out, left, RIGHT, FLOATW(min(last_pixel(c.head_u, c.tail_u, wide), width - 1)));
    put(out, left, TOP, FLOATW(max(first_pixel(c.head_v, c.tail_v, wide), 0)));
    put(out, left, BOTTOM, FLOATW(min(last_pixel(c.head_v, c.tail_v, wide), height - 1)));
}

static inline int words_of(const int particles)
{
    return (particles + WORD - 1) / WORD;
}

/* A word of the bits of every column and row of tiles. */
static inline void particle_bins(
    __global const float *restrict records, const int word, const int count, const int shown, const int width,
    const int height, __global ulong *restrict bins)
{
    const int columns = (width + TILE - 1) / TILE, rows = (height + TILE - 1) / TILE, stride = words_of(count);
    for (int k = 0; k < columns + rows; k++)
        bins[(size_t)k * stride + word] = 0;
    for (int j = 0; j < min(WORD, shown - WORD * word); j++) {
        __global const float *record = records + (size_t)RECORD * (WORD * word + j);
        for (int k = (int)record[LEFT] / TILE; k <= (int)record[RIGHT] / TILE; k++)
            bins[(size_t)k * stride + word] |= 1ul << j;
        for (int k = (int)record[TOP] / TILE; k <= (int)record[BOTTOM] / TILE; k++)
            bins[(size_t)(columns + k) * stride + word] |= 1ul << j;
    }
}

/* Opacity of a particle at pixels of a row, as a share of that on its axis. */
static inline floatw profile(__global const float *restrict record, const floatw u, const floatw v)
{
    const floatw across = record[STEEP] != 0.0f ? u : v, along = record[STEEP] != 0.0f ? v : u;
    const floatw m = along - record[M0];
    const floatw e = fma(-record[SLOPE_LO], m, fma(-record[SLOPE], m, across - record[N0])) - record[OFFSET];
    const floatw lean = record[SHEAR] * e, d = record[COSINE] * e;
    const floatw from_head = fma(record[STRETCH], m - record[HEAD_M], lean);
    const floatw from_tail = -fma(record[STRETCH], (along - record[TAIL_M0]) - record[TAIL_M], lean);
    const floatw over = fmax(fmax(-from_head, -from_tail), 0.0f);
    const floatw rho = fma(clamp(from_head * record[INV_LENGTH], 0.0f, 1.0f), record[GROWS], record[RADIUS]);
    /* (rho^2 - d^2 - over^2) / rho^2: what rounding takes off rho^2 would show at the edge */
    const floatw rho2 = rho * rho, left = fma(-over, over, fma(-d, d, rho2)) + fma(rho, rho, -rho2);
    const floatw q = fmax(left / rho2, 0.0f);
    return (q * q) * (q * q);
}

/* A vector of pixels in each row of a tile. */
typedef struct {
    floatw surface[TILE], inv_surface[TILE];
    floatw r[TILE], g[TILE], b[TILE], alpha[TILE];
    floatw log_nearest[TILE], taken[TILE];
} Strip;

/* Adds a particle to the rows of a strip; u: the strip's columns, v0: its first row. */
static inline void add_particle(Strip *strip, __global const float *restrict record, const floatw u, const int v0)
{
    const int first = max((int)record[TOP] - v0, 0), last = min((int)record[BOTTOM] - v0, TILE - 1);
    const float z = record[DEPTH];
#ifdef LAYERS
    const float log_z = log(z);
#endif
    for (int k = first; k <= last; k++) {
        const floatw shape = profile(record, u, (floatw)(v0 + k));
        if (!ANYW(shape > 0.0f))
            continue;
        const floatw shows = shape * smooth_ramp((strip->surface[k] - z) * strip->inv_surface[k] * (1.0f / BEHIND));
        const floatw a = record[OPACITY] * shows, left = fma(-strip->alpha[k], a, a);
        strip->r[k] = fma(left, record[RED], strip->r[k]);
        strip->g[k] = fma(left, record[GREEN], strip->g[k]);
        strip->b[k] = fma(left, record[BLUE], strip->b[k]);
        strip->alpha[k] += left;
#ifdef LAYERS
        const floatw covers = clamp(fma(record[COVERS] * shows - 0.5f, COVERED, (floatw)(0.5f)), 0.0f, 1.0f);
        const floatw more = fma(-strip->taken[k], covers, covers);
        strip->log_nearest[k] = fma(more, log_z, strip->log_nearest[k]);
        strip->taken[k] += more;
#endif
    }
}

/* All particles before the strip of pixels (u0 to u0 + W - 1, v0 to v0 + TILE - 1). */
static inline void particle_strip(
    Strip *strip, __global const float *restrict records, __global const ulong *restrict bins, const int count,
    const int shown, const int u0, const int v0, const int width, const int height, const int pitch,
    __global const float *restrict depth, __global const uchar *restrict sky)
{
    for (int k = 0; k < TILE; k++) {
        const int i = min(v0 + k, height - 1) * pitch + u0;
        const floatw z = fmin(fmax(LOADW(depth + i), 1e-3f), 1e9f);
        strip->surface[k] = SELECTW(LOADMASKW(sky + i), 1e9f, z);
        strip->inv_surface[k] = 1.0f / strip->surface[k];
        strip->r[k] = strip->g[k] = strip->b[k] = strip->alpha[k] = strip->log_nearest[k] = strip->taken[k] = 0.0f;
    }
    const int columns = (width + TILE - 1) / TILE, stride = words_of(count);
    __global const ulong *column = bins + (size_t)(u0 / TILE) * stride;
    __global const ulong *row = bins + (size_t)(columns + v0 / TILE) * stride;
    for (int word = 0; word < words_of(shown); word++)
        for (ulong bits = column[word] & row[word]; bits; bits &= bits - 1) {
            const int j = WORD * word + 63 - (int)clz(bits & -bits);
            __global const float *record = records + (size_t)RECORD * j;
            if (record[LEFT] < u0 + W && record[RIGHT] >= u0)
                add_particle(strip, record, (float)u0 + LANES, v0);
        }
}

/* Light of pixels before which there are particles. */
static inline void store_light(
    const Strip *strip, __global float *restrict rgb, const int u0, const int v0, const int height, const int pitch,
    const int plane)
{
    for (int k = 0; k < min(TILE, height - v0); k++) {
        if (!ANYW(strip->alpha[k] > 0.0f))
            continue;
        __global float *at = rgb + (v0 + k) * pitch + u0;
        const floatw keep = 1.0f - strip->alpha[k];
        STOREW(fma(keep, LOADW(at), strip->r[k]), at);
        STOREW(fma(keep, LOADW(at + plane), strip->g[k]), at + plane);
        STOREW(fma(keep, LOADW(at + 2 * plane), strip->b[k]), at + 2 * plane);
    }
}

/* The layers: how much particles hide, and the depth of the nearest that covers half of a pixel, or of the surface. Where
 * it is between, so is the depth: by its logarithm, which has no digits to lose. */
static inline void store_layers(
    const Strip *strip, __global const float *restrict depth, __global float *restrict alpha_layer,
    __global float *restrict depth_layer, const int u0, const int v0, const int height, const int pitch)
{
    for (int k = 0; k < min(TILE, height - v0); k++) {
        const int i = (v0 + k) * pitch + u0;
        const floatw left = 1.0f - strip->taken[k];
        STOREW(strip->alpha[k], alpha_layer + i);
        const floatw z = LOADW(depth + i), beyond = SELECTW(left > 0.0f, left * log(z), 0.0f);
        STOREW(SELECTW(strip->taken[k] > 0.0f, exp(strip->log_nearest[k] + beyond), z), depth_layer + i);
    }
}
#endif
