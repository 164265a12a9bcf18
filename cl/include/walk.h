/* walk.h - the walk up a mirrored ray: what of its lobe things cover, and their light. Mirrors reference_numpy/walk.py.
 *
 * All pixels of a vector lie in one row, so that they take the same steps.
 */
#ifndef WALK_H
#define WALK_H
#include "columns.h"
#include "gather.h"
#include "mirrored.h"
#include "ramps.h"
#include "row_means.h"
#include "vec.h"

#define FINER 5
#define EDGE 0.05f
#define FADE 0.25f
#define HIDDEN_M 4.0f
#define GROUND_M 0.03f
#define GROUND_SLOPE 0.01f

/* What stays the same on the whole walk. */
typedef struct {
    __global const float *pixels, *means;
    int width, height;           /* [px] */
    int row, apart;              /* [px] from one row of `pixels` to the next, and from depth to red, green, blue */
    int u, v;                    /* [px] first of the mirroring pixels */
    float lean;                  /* [px] to the right, a row down: in the middle of the lines' */
    float inv_fy;
    float inv_edge_v;            /* [1/px] */
    float reach_m, inv_reach_fade, thickness_m;
} Walk;

/* A pixel as it is seen from the mirrored ray. */
typedef struct {
    floatw ahead, t;             /* [m] beyond the mirroring place, and along the ray */
    floatw h, q;                 /* [m] above that place, above the ray */
    floatw pixel, width;         /* [m] a pixel there, half the lobe's width */
} Seen;

/* A share of the lobe or of a pixel and what it leaves of 1: next to the whole that needs digits of its own. The layer alone
 * shows it. */
typedef struct {
    floatw share;
#ifdef LAYERS
    floatw left;
#endif
} Part;
#ifdef LAYERS
#define PART(share, left) {share, left}
#else
#define PART(share, left) {share}
#endif

/* How much two columns side by side count, what the picture's borders leave, and how near the line is to the right one. */
typedef struct {
    floatw left, right, to_right;
#ifdef LAYERS
    floatw outside;
#endif
} Columns;

/* Two pixels of a row side by side and, between them, what they show of things. */
typedef struct {
    Place at;                    /* of the left one */
    int row;                     /* [px] how far up */
    Part lobe;                   /* its share below the things */
    floatw left, right, hidden;  /* parts of what is below whose light comes from each, and that hides the rays */
    floatw wide;                 /* [px] half the lobe's width, less a pixel */
} Things;

/* Sums over what covers the lobe: radiance, and 1; and what of the lobe is left to the surroundings. */
typedef struct {
    floatw r, g, b, own, left;
} Sums;

INLINE floatw ramp(const floatw x)
{
    return clamp(x, 0.0f, 1.0f);
}

INLINE Part larger(const Part a, const Part b)
{
    const Part p = PART(max(a.share, b.share), min(a.left, b.left));
    return p;
}

INLINE Part smaller(const Part a, const Part b)
{
    const Part p = PART(min(a.share, b.share), max(a.left, b.left));
    return p;
}

/* How much larger `b` is. What is left is known where the layer is asked for, which shows the least of it. */
INLINE floatw gain(const Part a, const Part b)
{
#ifdef LAYERS
    return max(SELECTW(a.share > 0.5f, a.left - b.left, b.share - a.share), 0.0f);
#else
    return max(b.share - a.share, 0.0f);
#endif
}

INLINE Seen seen(const Walk *k, const Mirrored *m, const floatw z, const Sharp over, const Sharp above)
{
    Seen p;
    p.ahead = z - m->Z0;
    p.t = max(p.ahead, 0.0f) * m->inv_Lz;
    p.h = height(&m->over, over, z);
    p.q = height(&m->above, above, z);
    p.pixel = z * k->inv_fy;
    p.width = fma(m->lobe, p.t, p.pixel);
    return p;
}

/* Whether something may cover: neither ground nor out of reach. */
INLINE intw stands_out(const Walk *k, const Seen *p)
{
    return (p->h > GROUND_M) & (p->ahead > 0.0f) & (p->t < k->reach_m);
}

/* [m] how far things reach below what is seen of them. */
INLINE floatw thick(const Walk *k, const Seen *p, const float stride)
{
    return fma(p->pixel, (floatw)stride, (floatw)k->thickness_m);
}

/* [m] how high above the mirroring place the ground itself may lie. */
INLINE floatw ground(const Seen *p)
{
    return fma(p->t, (floatw)GROUND_SLOPE, (floatw)GROUND_M);
}

/* Share of the lobe below it; `inv` is 1 / (thick ground). */
INLINE Part covers(const Walk *k, const Mirrored *m, const Seen *p, const float stride, const floatw inv)
{
    const floatw deep = thick(k, p, stride), half_q = 0.5f * (p->q / p->width);
    const floatw share = min(max(smooth_ramp(0.5f + half_q) - m->below, 0.0f) * m->inv_above, 1.0f);
    const floatw hangs = ramp(fma((deep + p->width - p->q) * (1.0f / FADE), inv * ground(p), (floatw)1.0f));
    const floatw stands = ramp(fma(p->h, inv * deep, (floatw)-1.0f));
    const floatw counts = hangs * stands * ramp(p->ahead * m->inv_near) * ramp((k->reach_m - p->t) * k->inv_reach_fade);
    const floatw above = min(smooth_ramp(0.5f - half_q) * m->inv_above, 1.0f);
    const Part lobe = PART(share * counts, fma(share, 1.0f - counts, above));
    return lobe;
}

/* Whether it stands before the mirroring place, so that the rays rise behind it, 0 to 1. */
INLINE Part hides(const Mirrored *m, const floatw ahead)
{
    const floatw hidden = ramp((HIDDEN_M + ahead) * (1.0f / (FADE * HIDDEN_M)));
    const floatw share = ramp(fma(-ahead, m->inv_near, (floatw)-1.0f)) * hidden;
    const Part lobe = PART(share, 1.0f - share);
    return lobe;
}

/* How much counts that lies so many columns, whole ones and a part, from a border of the picture. */
INLINE Part fading(const floatw columns, const floatw part, const int width)
{
    const float inv = 1.0f / width;
    const floatw left = fma(columns, (floatw)(-1.0f / EDGE), (floatw)width);
    const Part p = PART(ramp((columns + part) * (inv / EDGE)), ramp(fma(part, (floatw)(-1.0f / EDGE), left) * inv));
    return p;
}

/* How much the columns to both sides of the line count, so much right of the left one but for the low parts of its lean.
 * Next to the whole, little is left of either. */
INLINE Columns columns_between(
    const Walk *k, const Mirrored *m, const Place *at, const floatw beside, const int rows)
{
    const floatw column = FLOATW(at->off) + (float)at->first + LANES;
    const floatw to_r = ramp(fma((floatw)-rows, m->lean.lo, beside));
    const floatw to_l = ramp(fma((floatw)rows, m->lean.lo, 1.0f - beside));
    const Part from_l = fading(column, to_r, k->width);
    const Part from_r = fading((float)(k->width - 2) - column, to_l, k->width);
    const float v = clamp((float)(k->v - rows) * k->inv_edge_v, 0.0f, 1.0f);
    const floatw across = from_l.share * from_r.share, inside = across * v;
    Columns in = {to_l * inside, to_r * inside, to_r};
#ifdef LAYERS
    in.outside = fma(across, (floatw)(1.0f - v), fma(from_l.share, from_r.left, from_l.left));
#endif
    return in;
}

INLINE intw may_hide(const floatw ahead)
{
    return (ahead < 0.0f) & (ahead > -HIDDEN_M);
}

/* Columns in the picture left of where the lines pass `rows` above the pixels, and how far from there [px] that is but for
 * the low parts of their lean. */
INLINE Place columns_at(const Walk *k, const Mirrored *m, const intw asked, const int rows, floatw *beside)
{
#pragma OPENCL FP_CONTRACT OFF
    Place at;
#if W > 1
    const float first = floor(fma(-(float)rows, k->lean, (float)k->u));
    at.first = (int)first;
    at.off = 0;
    at.most = 0;
    *beside = fma((floatw)-rows, m->lean.hi, (floatw)(k->u - first));
    const intw in_it = fabs(fma((floatw)-rows, m->lean.lo, *beside - 0.5f)) < 0.5f - 0x1p-20f;
    if (at.first >= 0 && at.first + W <= k->width && !ANYW(asked & !in_it))
        return at;
#endif
    const floatw near = fma((floatw)-rows, m->lean.hi, m->u);
    const intw whole = TOINTW(near);
    const floatw rest = fma((floatw)-rows, m->lean.lo, near - FLOATW(whole));
    const intw column = whole + TOINTW(rest + 8.0f) - 8; /* within 2^-21 of a column it may be that column's */
    const intw x = min(max(column, (intw)0), (intw)(k->width - 1));
    *beside = near - FLOATW(x);
#if W == 1
    at.first = x;
    at.off = at.most = 0;
#else
    at.off = x - at.first - NUMBERS;
    const intw far = asked & ((at.off < -1) | (at.off > 1));
    at.most = at.first > 0 && at.first + W < k->width && !ANYW(far) ? 1 : 2;
#endif
    return at;
}

/* Finds what the picture shows `rows` above the pixels, between two of its columns, for those lanes that are asked for. Returns
 * whether that may cover more than `passed`; else it says nothing. */
INLINE int things(
    const Walk *k, const Mirrored *m, const intw asked, const floatw passed, const int rows, const int stride, Things *f)
{
#pragma OPENCL FP_CONTRACT OFF
    floatw beside;
    const Place at = columns_at(k, m, asked, rows, &beside);
    __global const float *depths = k->pixels + (k->v - rows) * k->row;
    FETCH_AT(depths + at.first + NEXT);
    const Pair z = pick(depths, &at);
    const floatw columns = FLOATW(at.off) + (float)(at.first - k->u);
    const Sharp over = slope(&m->over, columns, (float)rows), above = slope(&m->above, columns, (float)rows);
    const Sharp over_r = next_slope(&m->over, over);
    /* Most rows show nothing but ground, lower than what may cover. */
    const intw rises_l = (z.left < m->Z0) | (height(&m->over, over, z.left) > GROUND_M);
    const intw rises_r = (z.right < m->Z0) | (height(&m->over, over_r, z.right) > GROUND_M);
    if (!ANYW(asked & (rises_l | rises_r)))
        return 0;

    const Seen l = seen(k, m, z.left, over, above);
    const Seen r = seen(k, m, z.right, over_r, next_slope(&m->above, above));
    const intw before = asked & (may_hide(l.ahead) | may_hide(r.ahead));
    /* The smooth ramp of s is more than y only if s is more than min(y, (4 y + 1) / 6). */
    const floatw y = fma(passed, 1.0f - m->below, m->below);
    const floatw least = fma((floatw)2.0f, min(y, fma((floatw)(2.0f / 3.0f), y, (floatw)(1.0f / 6.0f))), (floatw)-1.0f);
    const intw more_l = stands_out(k, &l) & (l.q > least * l.width), more_r = stands_out(k, &r) & (r.q > least * r.width);
    if (!ANYW(before | asked & (more_l | more_r)))
        return 0;

    f->at = at;
    f->row = rows;
    const Columns in = columns_between(k, m, &at, beside, rows);
    const floatw a = thick(k, &l, stride) * ground(&l), b = thick(k, &r, stride) * ground(&r), inv = 1.0f / (a * b);
    const Part of_l = covers(k, m, &l, (float)stride, inv * b), of_r = covers(k, m, &r, (float)stride, inv * a);
    f->left = in.left * of_l.share;
    f->right = in.right * of_r.share;
    f->hidden = 0.0f;
#ifdef LAYERS
    f->lobe.left = in.outside + fma(in.left, of_l.left, in.right * of_r.left);
#endif
    if (ANYW(before)) {
        const Part hid_l = hides(m, l.ahead), hid_r = hides(m, r.ahead);
        f->hidden = fma(in.left, hid_l.share, in.right * hid_r.share);
#ifdef LAYERS
        f->lobe.left = in.outside + fma(in.left, min(of_l.left, hid_l.left), in.right * min(of_r.left, hid_r.left));
#endif
    }
    f->lobe.share = f->left + f->right + f->hidden;
    const floatw wide_l = l.t * r.pixel, wide_r = r.t * l.pixel;
    f->wide = m->lobe * fma(in.to_right, wide_r - wide_l, wide_l) / (l.pixel * r.pixel);
    return 1;
}

INLINE Pair light(__global const float *p, const Things *f)
{
    FETCH_AT(p + f->at.first + NEXT);
    return pick(p, &f->at);
}

/* The light of two pixels by their shares. */
INLINE void add_own(Sums *s, const Walk *k, const Things *f, const floatw left, const floatw right)
{
    __global const float *p = k->pixels + (k->v - f->row) * k->row + k->apart;
    const Pair r = light(p, f), g = light(p + k->apart, f), b = light(p + 2 * k->apart, f);
    s->r = fma(left, r.left, fma(right, r.right, s->r));
    s->g = fma(left, g.left, fma(right, g.right, s->g));
    s->b = fma(left, b.left, fma(right, b.right, s->b));
}

/* Leaves some of the lobe to the surroundings, which the layer alone shows. */
INLINE void leave(Sums *s, const floatw share)
{
#ifdef LAYERS
    s->left += share;
#endif
}

/* Things that cover `share` more of the lobe. */
INLINE void add(Sums *s, const Walk *k, const Things *f, const floatw share)
{
    const floatw part = share / max(f->lobe.share, 1e-30f), left = part * f->left, right = part * f->right;
    add_own(s, k, f, left, right);
    s->own += left + right;
    leave(s, part * f->hidden);
}

INLINE Pair mean(__global const float *restrict p, const Means at, const Things *f)
{
    const Pair a = pick(p + at.above, &f->at), b = pick(p + at.below, &f->at);
    const Pair s = {fma((floatw)at.lower, b.left - a.left, a.left), fma((floatw)at.lower, b.right - a.right, a.right)};
    return s;
}

/* The same in the mean light of things in the rows of the step. */
INLINE void add_mean(Sums *s, const Walk *k, const Things *f, const int stride, const floatw share)
{
    const floatw part = share / max(f->lobe.share, 1e-30f), left = part * f->left, right = part * f->right;
    s->own += left + right;
    leave(s, part * f->hidden);
    const Means at = means_around(k->v - f->row, stride, k->height, k->row);
    const Pair things = mean(k->means + 3 * at.size, at, f);
    /* Where the blocks show nothing but sky, the thing itself counts. */
    const floatw own_l = SELECTW(things.left < LEAST_MEAN, left, 0.0f);
    const floatw own_r = SELECTW(things.right < LEAST_MEAN, right, 0.0f);
    const floatw by_l = (left - own_l) / max(things.left, LEAST_MEAN);
    const floatw by_r = (right - own_r) / max(things.right, LEAST_MEAN);
    const Pair r = mean(k->means, at, f), g = mean(k->means + at.size, at, f), b = mean(k->means + 2 * at.size, at, f);
    s->r = fma(by_l, r.left, fma(by_r, r.right, s->r));
    s->g = fma(by_l, g.left, fma(by_r, g.right, s->g));
    s->b = fma(by_l, b.left, fma(by_r, b.right, s->b));
    if (ANYW(own_l + own_r > 0.0f))
        add_own(s, k, f, own_l, own_r);
}

/* The rows of a step in finer steps, twice over: sums of what covers from `passed` to `to`, `weight` of it. */
OUT_OF_LINE void walk_finer(
    Sums *s, const Walk *k, const Mirrored *m, const int start, const Things *end, Part passed, const Part to,
    const floatw weight)
{
    const int stride = end->row - start;
    for (int i = 1, before = start; i <= FINER; i++) {
        const int rows = start + (i * stride + FINER - 1) / FINER;
        if (rows == before)
            continue;
        Things found;
        const Things *const mid = i == FINER ? end : &found;
        if (i < FINER && !things(k, m, gain(passed, to) > 0.0f, passed.share, rows, stride, &found)) {
            before = rows;
            continue;
        }
        const Part most = smaller(larger(mid->lobe, passed), to);
        if (ANYW(gain(passed, most) > 0.0f))
            for (int j = 1, last = before; j <= FINER; j++) {
                const int row = before + (j * (rows - before) + FINER - 1) / FINER;
                if (row == last)
                    continue;
                last = row;
                Things finest;
                if (row < rows && !things(k, m, gain(passed, most) > 0.0f, passed.share, row, stride, &finest))
                    continue;
                const Things *const f = row == rows ? mid : &finest;
                const Part now = smaller(larger(f->lobe, passed), most);
                const floatw share = gain(passed, now);
                if (ANYW(share > 0.0f))
                    add(s, k, f, weight * share);
                passed = now;
            }
        before = rows;
    }
}

/* What a step adds: in finer steps where the lobe is narrow, in the mean where it is wide. */
INLINE void add_step(
    Sums *s, const Walk *k, const Mirrored *m, const int start, const Things *f, const Part passed, const Part to,
    const floatw share)
{
    const int stride = f->row - start;
    const float inv = 2.0f / stride;
    const floatw wide = stride > 1 ? ramp(fma(f->wide, (floatw)inv, (floatw)(inv - 1.0f))) : (floatw)0.0f;
    const floatw blurred = wide * share;
    if (ANYW(blurred > 0.0f))
        add_mean(s, k, f, stride, blurred);
    const intw sharp = wide < 1.0f;
    const Part sharp_to = PART(SELECTW(sharp, to.share, passed.share), SELECTW(sharp, to.left, passed.left));
    if (ANYW(gain(passed, sharp_to) > 0.0f))
        walk_finer(s, k, m, start, f, passed, sharp_to, 1.0f - wide);
}

/* [rows] beyond which nothing covers the lobe. A thing q above the ray is z (p.r) - Z0 (p.r0) with p.r of its own line of
 * sight, which grows by the row; none counts above the lobe, what it reaches down and what a step may miss. A row and a
 * column are added for rounding. */
INLINE floatw last_row(const Walk *k, const Mirrored *m, const int steps)
{
    const floatw climb = fma(-m->lean.hi, m->above.by_u.hi, -m->above.by_v.hi);
    const floatw top = fma(m->lobe, m->inv_Lz, (2.5f * (k->v / steps + 3) + 4.0f) * k->inv_fy);
    const intw above = (climb > 0.0f) & (-m->above.own.hi > (1.0f + FADE) * k->thickness_m);
    return SELECTW(above, (top + 2.0f * fabs(m->above.by_u.hi) - m->above.at.hi) / climb, (float)k->height);
}

/* Up the line; a step that covers some of the lobe is walked again in finer ones where the lobe is narrow. */
OUT_OF_LINE Sums walk(const Walk *k, const Mirrored *m, const int steps)
{
    Sums s = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    const floatw last = last_row(k, m, steps);
    Part passed = PART(0.0f, 1.0f);
    for (int step = 1, before = 0; step <= steps; step++) {
        const int rows = (step * step * k->v + steps * steps - 1) / (steps * steps), stride = rows - before;
        const intw asked = m->on & (passed.share < 1.0f) & (last > (float)before);
        if (!ANYW(asked))
            break;
        if (stride == 0)
            continue;
        Things f;
        if (things(k, m, asked, passed.share, rows, stride, &f)) {
            const Part up_to = larger(passed, f.lobe);
            const Part to = PART(SELECTW(asked, up_to.share, passed.share), SELECTW(asked, up_to.left, passed.left));
            const floatw share = gain(passed, to);
            if (ANYW(share > 0.0f))
                add_step(&s, k, m, before, &f, passed, to, share);
            passed = to;
        }
        before = rows;
    }
#ifdef LAYERS
    s.left += passed.left;
#endif
    return s;
}
#endif
