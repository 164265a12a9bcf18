/* blending.h - particles before a picture, from the nearest to the farthest. Mirrors reference_numpy/blending.py.
 *
 * A particle that shows has a record, all that the pixels must know of it, and a bit in the words of every column and of
 * every row of tiles that it reaches. A strip of pixels walks over the bits that its column and its row share.
 *
 * Given at build time: TILE pixels a side of a tile, RECORD floats a record.
 */
#ifndef BLENDING_H
#define BLENDING_H
#include "capsules.h"
#include "gather.h"
#include "particle_light.h"
#include "ramps.h"
#include "vec.h"

#define WORD 64          /* particles a word of bits */
#define BEHIND 0.01f
#define COVERED 4.0f

/* Fields of a record. The axis runs along the major coordinate m, columns or rows, in which it is longer; the minor one
 * is n = n0 + k (m - m0). */
enum {
    M0, N0, HEAD_M, TAIL_M0, TAIL_M, SLOPE, SLOPE_LO, OFFSET, /* whole pixels, and what is left of them, of the ends */
    COSINE, STRETCH, SHEAR, INV_LENGTH,                       /* of the axis to m; signed by the way to the tail */
    DEPTH, RADIUS, GROWS, OPACITY,
    COVERS, RED, GREEN, BLUE,
    STEEP,
    LEFT = RECORD - 4, RIGHT, TOP, BOTTOM                     /* whole pixels */
};
#define FOUR(field) ((field) / 4) /* which four floats of a record a field is in, of which DEPTH and LEFT are the first */
#define FOURS (RECORD / 4)

/* Stores a field of W records, of which `left` are there. */
static inline void put(__global float *restrict record, const int left, const int field, const floatw values)
{
    float v[W];
    STOREW(values, v);
    for (int j = 0; j < min(W, left); j++)
        record[RECORD * j + field] = v[j];
}

/* The pixels that particles reach. */
static inline void put_box(__global float *restrict out, const int left, const Falling f, const Capsule c)
{
    const floatw wide = fmax(c.head_radius, c.tail_radius);
    put(out, left, LEFT, FLOATW(max(first_pixel(c.head_u, c.tail_u, wide), (intw)(0))));
    put(out, left, RIGHT, FLOATW(min(last_pixel(c.head_u, c.tail_u, wide), (intw)(f.width - 1))));
    put(out, left, TOP, FLOATW(max(first_pixel(c.head_v, c.tail_v, wide), (intw)(0))));
    put(out, left, BOTTOM, FLOATW(min(last_pixel(c.head_v, c.tail_v, wide), (intw)(f.height - 1))));
}

/* How particles lie in the picture. */
static inline void put_axis(__global float *restrict out, const int left, const Capsule c)
{
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
    put(out, left, STEEP, SELECTW(steep, 1.0f, 0.0f));
    put(out, left, INV_LENGTH, 1.0f / fmax(c.length, 1e-30f));
    put(out, left, RADIUS, c.head_radius);
    put(out, left, GROWS, c.tail_radius - c.head_radius);
}

/* W of the numbers in a list from j on, the last of its `end` again beyond it. */
static inline intw listed(__global const uint *restrict numbers, const int j, const int end)
{
    int held[W];
    for (int k = 0; k < W; k++)
        held[k] = numbers[min(j + k, end - 1)];
    return LOADW(held);
}

/* Records of W particles in order, from j0 on. */
static inline void write_records(
    const Falling f, const Light by, const int j0, const int shown, __global const uint *restrict order,
    __global float *restrict records)
{
    const Capsule c = capsule(f, listed(order, j0, shown));
    const Triple color = particle_color(by, c.x, c.y, c.z);
    __global float *out = records + (size_t)RECORD * j0;
    const int left = shown - j0;
    put_axis(out, left, c);
    put_box(out, left, f, c);
    put(out, left, DEPTH, c.z);
    put(out, left, OPACITY, c.opacity);
    put(out, left, COVERS, c.covers);
    put(out, left, RED, color.x);
    put(out, left, GREEN, color.y);
    put(out, left, BLUE, color.z);
}

/* Pixels that W particles reach: left, right, top, bottom. They are read at once, for records are far away: to wait for
 * one after the other takes longer than all that is done with them. */
static inline Quad boxes(__global const float *restrict records, const intw i)
{
    return gather(records, FOURS * i + FOUR(LEFT));
}

static inline int words_of(const int particles)
{
    return (particles + WORD - 1) / WORD;
}

/* Turns a bit over where the words first to last of `end` begin, and where they end. */
static inline void toggle(
    __global ulong *restrict words, const size_t stride, const ulong bit, const int first, const int last,
    const int end)
{
    words[first * stride] ^= bit;
    if (last + 1 < end)
        words[(last + 1) * stride] ^= bit;
}

/* Carries bits that were turned over along the words. */
static inline void carry(__global ulong *restrict words, const size_t stride, const int end)
{
    ulong on = 0;
    for (int k = 0; k < end; k++)
        words[k * stride] = on ^= words[k * stride];
}

/* A word of the bits of every column and row of tiles. */
static inline void write_bins(
    __global const float *restrict records, const int word, const int count, const int shown, const int width,
    const int height, __global ulong *restrict bins)
{
    const int columns = (width + TILE - 1) / TILE, rows = (height + TILE - 1) / TILE;
    const size_t stride = words_of(count);
    __global ulong *column = bins + word, *row = column + columns * stride;
    for (int k = 0; k < columns + rows; k++)
        column[k * stride] = 0;
    for (int j0 = 0; j0 < min(WORD, shown - WORD * word); j0 += W) {
        int left[W], right[W], top[W], bottom[W];
        const Quad box = boxes(records, min(WORD * word + j0 + INTW(LANES), (intw)(shown - 1)));
        STOREW(INTW(box.x) / TILE, left);
        STOREW(INTW(box.y) / TILE, right);
        STOREW(INTW(box.z) / TILE, top);
        STOREW(INTW(box.w) / TILE, bottom);
        for (int j = 0; j < min(W, shown - WORD * word - j0); j++) {
            toggle(column, stride, 1ul << (j0 + j), left[j], right[j], columns);
            toggle(row, stride, 1ul << (j0 + j), top[j], bottom[j], rows);
        }
    }
    carry(column, stride, columns);
    carry(row, stride, rows);
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
    int u0, v0;
    float farthest;                  /* of the surfaces [m] */
    floatw surface[TILE], inv_surface[TILE];
    floatw r[TILE], g[TILE], b[TILE], alpha[TILE];
    floatw log_nearest[TILE], taken[TILE];
} Strip;

/* The surfaces of the pixels (u0 to u0 + W - 1, v0 to v0 + TILE - 1), before which there is nothing yet. */
static inline void clear_strip(
    Strip *strip, const int u0, const int v0, const int height, const int pitch, __global const float *restrict depth,
    __global const uchar *restrict sky)
{
    floatw farthest = 0.0f;
    for (int k = 0; k < TILE; k++) {
        const int i = min(v0 + k, height - 1) * pitch + u0;
        const floatw z = fmin(fmax(LOADW(depth + i), 1e-3f), 1e9f);
        strip->surface[k] = SELECTW(LOADMASKW(sky + i), 1e9f, z);
        strip->inv_surface[k] = 1.0f / strip->surface[k];
        strip->r[k] = strip->g[k] = strip->b[k] = strip->alpha[k] = strip->log_nearest[k] = strip->taken[k] = 0.0f;
        farthest = fmax(farthest, strip->surface[k]);
    }
    strip->u0 = u0;
    strip->v0 = v0;
    strip->farthest = MAXW(farthest);
}

/* Adds a particle to the rows of a strip. None is left out where it does not show: to find out takes longer. */
static inline void add_particle(Strip *strip, __global const float *restrict record)
{
    const int v0 = strip->v0;
    const int first = max((int)record[TOP] - v0, 0), last = min((int)record[BOTTOM] - v0, TILE - 1);
    const floatw u = (float)strip->u0 + LANES;
    const float z = record[DEPTH];
#ifdef LAYERS
    const float log_z = log(z);
#endif
    for (int k = first; k <= last; k++) {
        const floatw shape = profile(record, u, (floatw)(v0 + k));
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

/* Adds those of W particles that reach a strip, of which `left` are there. */
static inline void add_particles(
    Strip *strip, __global const float *restrict records, const int *found, const int left)
{
    const intw i = LOADW(found);
    const Quad box = boxes(records, i);
    const floatw z = gather(records, FOURS * i + FOUR(DEPTH)).x;
    int reaches[W];
    STOREW((z < strip->farthest) & (box.x < (float)(strip->u0 + W)) & (box.y >= (float)strip->u0), reaches);
    for (int j = 0; j < left; j++)
        if (reaches[j])
            add_particle(strip, records + (size_t)RECORD * found[j]);
}

/* The next word from `word` on in which a column and a row share a bit. */
static inline int shared(
    __global const ulong *restrict column, __global const ulong *restrict row, int word, const int words)
{
    while (word < words && !(column[word] & row[word]))
        word++;
    return word;
}

/* Adds all particles whose bits are in a column and in a row of words; `steps` of depth a metre put them in order. */
static inline void add_marked(
    Strip *strip, __global const float *restrict records, __global const ulong *restrict column,
    __global const ulong *restrict row, const int shown, const float steps)
{
    const float end = strip->farthest + 2.0f / steps;
    int found[W] = {0}, n = 0;
    const int words = words_of(shown);
    for (int word = shared(column, row, 0, words); word < words; word = shared(column, row, word + 1, words))
        for (ulong bits = column[word] & row[word]; bits; bits &= bits - 1) {
            found[n++] = WORD * word + 63 - (int)clz(bits & -bits);
            if (n < W)
                continue;
            add_particles(strip, records, found, W);
            if (records[(size_t)RECORD * found[W - 1] + DEPTH] > end)
                return;
            n = 0;
        }
    for (int j = n; j < W; j++)
        found[j] = found[0];
    if (n > 0)
        add_particles(strip, records, found, n);
}

/* Light of pixels before which there are particles. */
static inline void store_light(
    const Strip *strip, __global float *restrict rgb, const int height, const int pitch, const int plane)
{
    for (int k = 0; k < min(TILE, height - strip->v0); k++) {
        if (!ANYW(strip->alpha[k] > 0.0f))
            continue;
        __global float *at = rgb + (strip->v0 + k) * pitch + strip->u0;
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
    __global float *restrict depth_layer, const int height, const int pitch)
{
    for (int k = 0; k < min(TILE, height - strip->v0); k++) {
        const int i = (strip->v0 + k) * pitch + strip->u0;
        const floatw left = 1.0f - strip->taken[k];
        STOREW(strip->alpha[k], alpha_layer + i);
        const floatw z = LOADW(depth + i), beyond = SELECTW(left > 0.0f, left * log(z), 0.0f);
        STOREW(SELECTW(strip->taken[k] > 0.0f, exp(strip->log_nearest[k] + beyond), z), depth_layer + i);
    }
}
#endif
