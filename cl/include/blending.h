/* blending.h - particles before a picture, from the nearest to the farthest. Mirrors reference_numpy/blending.py.
 *
 * A particle that shows has a record, all that the pixels must know of it, and a bit in the words of every column and of
 * every row of tiles that it reaches. A strip of pixels walks over the bits that its column and its row share.
 *
 * Given at build time: TILE columns and BAND rows of a tile, RECORD floats a record.
 */
#ifndef BLENDING_H
#define BLENDING_H
#include "capsules.h"
#include "gather.h"
#include "particle_light.h"
#include "ramps.h"
#include "vec.h"

#define WORD 64          /* particles a word of bits */
#define WORDS 8          /* a bundle of words, which is worked on at once */
#define BUNDLE (WORD * WORDS)
#define BEHIND 0.01f
#define COVERED 4.0f

/* Fields of a record, stored by fours. The axis runs along the major coordinate m, columns or rows, in which it is longer;
 * the minor one is n = n0 + k (m - m0). */
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

/* Stores four fields of W records, from `field` on. */
static inline void put(
    __global float *restrict record, const int field, const floatw a, const floatw b, const floatw c, const floatw d)
{
    const Quad q = {a, b, c, d};
    spread(record + field, RECORD, q);
}

/* The pixels that particles reach: left, right, top, bottom. */
static inline Quad box_of(const Falling f, const Capsule c)
{
    const floatw wide = fmax(c.head_radius, c.tail_radius);
    const Quad box = {
        FLOATW(max(first_pixel(c.head_u, c.tail_u, wide), (intw)(0))),
        FLOATW(min(last_pixel(c.head_u, c.tail_u, wide), (intw)(f.width - 1))),
        FLOATW(max(first_pixel(c.head_v, c.tail_v, wide), (intw)(0))),
        FLOATW(min(last_pixel(c.head_v, c.tail_v, wide), (intw)(f.height - 1)))};
    return box;
}

/* How particles lie in the picture, and what light they have. */
static inline void put_capsule(__global float *restrict out, const Capsule c, const Triple color)
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
    put(out, M0, m0, n0, m, t0);
    put(out, TAIL_M, (tail_m.hi - t0) + tail_m.lo, k.hi, k.lo, fma(-k.hi, m, n));
    put(out, COSINE, cosine, sign * fma(k.hi * k.hi, cosine, cosine), sign * k.hi * cosine, 1.0f / fmax(c.length, 1e-30f));
    put(out, DEPTH, c.z, c.head_radius, c.tail_radius - c.head_radius, c.opacity);
    put(out, COVERS, c.covers, color.x, color.y, color.z);
    put(out, STEEP, SELECTW(steep, 1.0f, 0.0f), 0.0f, 0.0f, 0.0f);
}

/* W of the numbers in a list from j on, the last of its `end` again beyond it. */
static inline intw listed(__global const uint *restrict numbers, const int j, const int end)
{
    int held[W];
    for (int k = 0; k < W; k++)
        held[k] = numbers[min(j + k, end - 1)];
    return LOADW(held);
}

/* Records and boxes of W particles in order, from j0 on; there is room for a vector beyond the last one. */
static inline void write_records(
    const Falling f, const Light by, const int j0, const int shown, __global const uint *restrict order,
    __global float *restrict records, __global float *restrict all_boxes)
{
    const Capsule c = capsule(f, listed(order, j0, shown));
    const Quad box = box_of(f, c);
    __global float *out = records + (size_t)RECORD * j0;
    put_capsule(out, c, particle_color(by, c.x, c.y, c.z));
    spread(out + LEFT, RECORD, box);
    store_lanes(all_boxes + 4 * (size_t)j0, box);
}

/* Pixels that W particles reach: left, right, top, bottom. They are read at once, for records are far away: to wait for
 * one after the other takes longer than all that is done with them. */
static inline Quad boxes(__global const float *restrict records, const intw i)
{
    return gather(records, FOURS * i + FOUR(LEFT));
}

static inline int bundles_of(const int particles)
{
    return (particles + BUNDLE - 1) / BUNDLE;
}

/* Words from one column or row to the next. */
static inline size_t words_of(const int particles)
{
    return (size_t)WORDS * bundles_of(particles);
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

/* Carries bits that were turned over along a bundle's words. */
static inline void carry(__global ulong *restrict words, const size_t stride, const int end)
{
    ulong8 on = 0;
    for (int k = 0; k < end; k++) {
        on ^= vload8(0, words + k * stride);
        vstore8(on, 0, words + k * stride);
    }
}

/* A bundle of words of the bits of every column and row of tiles. */
static inline void write_bins(
    __global const float *restrict all_boxes, const int bundle, const int count, const int shown, const int width,
    const int height, __global ulong *restrict bins)
{
    const int columns = (width + TILE - 1) / TILE, rows = (height + BAND - 1) / BAND;
    const int end = min(BUNDLE * (bundle + 1), shown);
    const size_t stride = words_of(count);
    __global ulong *column = bins + WORDS * bundle, *row = column + columns * stride;
    for (int k = 0; k < columns + rows; k++)
        vstore8((ulong8)(0), 0, column + k * stride);
    for (int j0 = BUNDLE * bundle; j0 < end; j0 += W) {
        int left[W], right[W], top[W], bottom[W];
        const Quad box = load_lanes(all_boxes + 4 * (size_t)j0);
        STOREW(INTW(box.x) / TILE, left);
        STOREW(INTW(box.y) / TILE, right);
        STOREW(INTW(box.z) / BAND, top);
        STOREW(INTW(box.w) / BAND, bottom);
        const int word = (j0 - BUNDLE * bundle) / WORD;
        for (int j = 0; j < min(W, end - j0); j++) {
            const ulong bit = 1ul << ((j0 + j) % WORD);
            toggle(column + word, stride, bit, left[j], right[j], columns);
            toggle(row + word, stride, bit, top[j], bottom[j], rows);
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
    const floatw from_tail = fma(-record[STRETCH], (along - record[TAIL_M0]) - record[TAIL_M], -lean);
    const floatw nearer = SELECTW(from_head < from_tail, from_head, from_tail), over = fmin(nearer, 0.0f);
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
    float before[BAND];              /* what is nearer than this is wholly before a row's surfaces [m] */
    floatw surface[BAND];
    floatw r[BAND], g[BAND], b[BAND], alpha[BAND];
    floatw log_nearest[BAND], taken[BAND];
} Strip;

/* The surfaces of the pixels (u0 to u0 + W - 1, v0 to v0 + BAND - 1), before which there is nothing yet. */
static inline void clear_strip(
    Strip *strip, const int u0, const int v0, const int height, const int pitch, __global const float *restrict depth,
    __global const uchar *restrict sky)
{
    floatw farthest = 0.0f;
    for (int k = 0; k < BAND; k++) {
        const int i = min(v0 + k, height - 1) * pitch + u0;
        const floatw z = fmin(fmax(LOADW(depth + i), 1e-3f), 1e9f);
        strip->surface[k] = SELECTW(LOADMASKW(sky + i), 1e9f, z);
        strip->before[k] = (1.0f - BEHIND - 1e-5f) * MINW(strip->surface[k]);
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
    const int first = max((int)record[TOP] - v0, 0), last = min((int)record[BOTTOM] - v0, BAND - 1);
    const floatw u = (float)strip->u0 + LANES;
    const float z = record[DEPTH];
#ifdef LAYERS
    const float log_z = log(z);
#endif
    for (int k = first; k <= last; k++) {
        floatw shows = profile(record, u, (floatw)(v0 + k));
        if (z > strip->before[k])
            shows *= smooth_ramp((strip->surface[k] - z) / strip->surface[k] * (1.0f / BEHIND));
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

/* Asks for the records of W particles: they are far away, and take longer to come than others to be drawn. */
static inline void ask_for(__global const float *restrict records, const int *found)
{
    for (int j = 0; j < W; j++)
        for (int line = 0; line < RECORD; line += 16)
            PREFETCH(records + (size_t)RECORD * found[j] + line);
}

/* Adds those of W particles that reach a strip, of which `left` are there. */
static inline void add_particles(
    Strip *strip, __global const float *restrict records, const int *found, const int left)
{
    if (left == 0)
        return;
    const intw i = LOADW(found);
    const Quad box = boxes(records, i);
    const floatw z = gather(records, FOURS * i + FOUR(DEPTH)).x;
    int reaches[W];
    STOREW((z < strip->farthest) & (box.x < (float)(strip->u0 + W)) & (box.y >= (float)strip->u0), reaches);
    for (int j = 0; j < left; j++)
        if (reaches[j])
            add_particle(strip, records + (size_t)RECORD * found[j]);
}

static inline int lowest_bit(const ulong bits)
{
    return 63 - (int)clz(bits & -bits);
}

/* Adds all particles whose bits are in a column and in a row of words; `steps` of depth a metre put them in order. */
static inline void add_marked(
    Strip *strip, __global const float *restrict records, __global const ulong *restrict column,
    __global const ulong *restrict row, const int shown, const float steps)
{
    const float end = strip->farthest + 2.0f / steps;
    int found[W] = {0}, n = 0, asked_for[W] = {0}, ready = 0;
    for (int bundle = 0; bundle < bundles_of(shown); bundle++) {
        ulong words[WORDS];
        const ulong8 both = vload8(bundle, column) & vload8(bundle, row);
        ulong marked = as_ulong(convert_char8(both != (ulong8)(0))); /* a byte a word */
        vstore8(both, 0, words);
        for (int k; marked; marked &= ~(0xFFul << 8 * k)) {
            k = lowest_bit(marked) / 8;
            for (ulong bits = words[k]; bits; bits &= bits - 1) {
                found[n++] = BUNDLE * bundle + WORD * k + lowest_bit(bits);
                if (n < W)
                    continue;
                ask_for(records, found);
                add_particles(strip, records, asked_for, ready);
                if (ready && records[(size_t)RECORD * asked_for[W - 1] + DEPTH] > end)
                    return;
                for (int j = 0; j < W; j++)
                    asked_for[j] = found[j];
                ready = W;
                n = 0;
            }
        }
    }
    add_particles(strip, records, asked_for, ready);
    for (int j = n; j < W; j++)
        found[j] = found[0];
    add_particles(strip, records, found, n);
}

/* Light of pixels before which there are particles. */
static inline void store_light(
    const Strip *strip, __global float *restrict rgb, const int height, const int pitch, const int plane)
{
    for (int k = 0; k < min(BAND, height - strip->v0); k++) {
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
    for (int k = 0; k < min(BAND, height - strip->v0); k++) {
        const int i = (strip->v0 + k) * pitch + strip->u0;
        const floatw left = 1.0f - strip->taken[k];
        STOREW(strip->alpha[k], alpha_layer + i);
        const floatw z = LOADW(depth + i), beyond = SELECTW(left > 0.0f, left * log(z), 0.0f);
        STOREW(SELECTW(strip->taken[k] > 0.0f, exp(strip->log_nearest[k] + beyond), z), depth_layer + i);
    }
}
#endif
