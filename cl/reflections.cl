/* reflections.cl - what wet ground mirrors of the frame itself. Mirrors reference_numpy/reflections.py.
 *
 * Two stages: reflections_pixels keeps radiance and depth as they were while the picture changes, and its means by
 * rows; reflections walks the mirrored rays. All pixels of a vector lie in one row, so that they take the same steps.
 * Heights above a ray are carried as a float and what it leaves out: a small difference of large numbers decides what a
 * sharp mirror shows.
 */
#include "include/brdf.h"
#include "include/environment.h"
#include "include/ramps.h"
#include "include/vec.h"
#include "include/world.h"

#define STRIP 8          /* vectors */
#define FINER 5
/* Rows over which radiance is averaged. */
#define BLOCKS 3
__constant int BLOCK_ROWS[BLOCKS] = {3, 9, 27};
#define WET 0.25f
#define SMOOTH 0.5f
#define LOBE 2.0f
#define NEAR 0.005f
#define EDGE 0.05f
#define FADE 0.25f
#define HIDDEN_M 4.0f
#define GROUND_M 0.03f
#define GROUND_SLOPE 0.01f
#define OWN 1e-6f
#define NOTHING 1e6f     /* [m] depth of the sky */
#define MIN_COSINE 0.05f
#define MIN_AHEAD 0.1f
#define MIN_RISE 0.25f

/* What stays the same on the whole walk. */
typedef struct {
    __global const float *pixels, *means;
    int height;                  /* [px] */
    int row, apart;              /* [px] from one row of `pixels` to the next, and from depth to red, green, blue */
    int width;                   /* [px] */
    float fy, inv_fy;
    float inv_edge_u, inv_edge_v; /* [1/px] */
    float reach_m, inv_reach_fade, thickness_m;
    Sharp up_u, up_v;            /* [1/px] of the world's up along the picture */
    int v;                       /* [px] row of the mirroring pixels */
} Walk;

/* Mirrored rays of a vector of pixels. */
typedef struct {
    intw on;                     /* which are wanted */
    floatw u, Z0, inv_near;      /* [px], [m], [1/m] */
    Sharp p_r, p_u, p_v;         /* square to the ray, upwards: along the line of sight, and by pixel */
    Sharp lean;                  /* [px] to the right, a row down */
    floatw reach, last;          /* [m] of depth, [rows] beyond which nothing covers the lobe */
    Sharp up_r;
    floatw inv_Lz, lobe;
    floatw below, inv_above;     /* share of the lobe below the level, and 1 over that above it */
} Mirrored;

/* What the picture shows at a step. */
typedef struct {
    floatw up_to;                /* share of the lobe below it */
    floatw r, g, b, own;         /* radiance and 1, as far as it is mirrored and does not hide the rays */
    floatw mean_r, mean_g, mean_b; /* the same in the step's mean */
    floatw wide;                 /* [px] half the lobe's width */
} Things;

/* Sums over what covers the lobe. */
typedef struct {
    floatw r, g, b, own;
} Seen;

#if W == 1
#define FIRST(x) (x)
#define LAST(x) (x)
static inline floatw pick(__global const float *restrict p, const int at, const int together)
{
    return p[at];
}
#else
#define FIRST(x) (x).s0
#if W == 4
#define LAST(x) (x).s3
#elif W == 8
#define LAST(x) (x).s7
#else
#define LAST(x) (x).sf
#endif
/* Values from places that may lie side by side: on level ground they all but always do. */
static inline floatw pick(__global const float *restrict p, const intw at, const int together)
{
    if (together)
        return LOADW(p + at.s0);
    int from[W];
    float found[W];
    JOIN(vstore, W)(at, 0, from);
    for (int j = 0; j < W; j++)
        found[j] = p[from[j]];
    return JOIN(vload, W)(0, found);
}
#endif

static inline floatw ramp(const floatw x)
{
    return clamp(x, 0.0f, 1.0f);
}

static inline Sharp sharp_times(const Sharp a, const Sharp b)
{
    return sharp_product(a, b.hi, b.lo);
}

static inline Sharp sharp_scaled(const Sharp a, const floatw b)
{
    return sharp_product(a, b, 0.0f);
}

static inline Sharp inverse(const float f)
{
#pragma OPENCL FP_CONTRACT OFF
    const float inv = 1.0f / f;
    const Sharp s = {inv, fma(-inv, f, 1.0f) * inv};
    return s;
}

/* Where the means of a size of blocks begin: red, green, blue and the share of things, a plane each. */
static inline int first_mean(const int block, const int height, const int row)
{
    int first = 0;
    for (int i = 0; i < block; i++)
        first += 4 * row * ((height + BLOCK_ROWS[i] - 1) / BLOCK_ROWS[i]);
    return first;
}

static inline void write_row(__global float *restrict to, const floatw x, const int last)
{
    STOREW(x, to);
    if (last)
        to[W] = LAST(x);
}

__kernel void reflections_pixels(
    __global float *restrict reflection_pixels,
    __global float *restrict reflection_means,
    __global const float *restrict rgb,
    __global const float *restrict emissive,
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
    const int height,                                   /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane)                                    /* [px] distance between the planes of one image */
{
    const int u0 = get_global_id(0) * W, v = get_global_id(1);
    const int i = v * pitch + u0, to = i + v, apart = height * (pitch + 1);
    const floatw r = LOADW(rgb + i), g = LOADW(rgb + i + plane), b = LOADW(rgb + i + 2 * plane);
    const floatw z = SELECTW(LOADMASKW(sky + i), NOTHING, fmin(LOADW(depth + i), NOTHING));
    const int last = u0 + W == pitch;
    write_row(reflection_pixels + to, z, last);
    write_row(reflection_pixels + to + apart, r, last);
    write_row(reflection_pixels + to + 2 * apart, g, last);
    write_row(reflection_pixels + to + 3 * apart, b, last);

    for (int block = 0; block < BLOCKS; block++) {
        const int rows = BLOCK_ROWS[block], count = min(rows, height - v);
        if (v % rows != 0)
            continue;
        floatw sum_r = 0.0f, sum_g = 0.0f, sum_b = 0.0f, things = 0.0f;
        for (int k = 0; k < count; k++) {
            const int at = i + k * pitch;
            const intw solid = !LOADMASKW(sky + at) & (LOADW(depth + at) < NOTHING);
            sum_r += SELECTW(solid, fmax(LOADW(rgb + at) - LOADW(emissive + at), 0.0f), 0.0f);
            sum_g += SELECTW(solid, fmax(LOADW(rgb + at + plane) - LOADW(emissive + at + plane), 0.0f), 0.0f);
            sum_b += SELECTW(solid, fmax(LOADW(rgb + at + 2 * plane) - LOADW(emissive + at + 2 * plane), 0.0f), 0.0f);
            things += SELECTW(solid, 1.0f, 0.0f);
        }
        const int size = (height + rows - 1) / rows * (pitch + 1);
        __global float *restrict mean = reflection_means + first_mean(block, height, pitch + 1) + v / rows * (pitch + 1) + u0;
        const float inv = 1.0f / count;
        write_row(mean, sum_r * inv, last);
        write_row(mean + size, sum_g * inv, last);
        write_row(mean + 2 * size, sum_b * inv, last);
        write_row(mean + 3 * size, things * inv, last);
    }
}

/* Which vector and row a work-item stands for. On a CPU they go down one strip of the picture after the other, so that the
 * rows above, which their rays look up, stay in its cache; a GPU reads those of neighbouring columns together. */
static inline int2 down_strips(const int height)
{
    const int2 place = {get_global_id(0), get_global_id(1)};
#if W > 1
    const int columns = get_global_size(0), n = place.y * columns + place.x;
    const int first = n / (STRIP * height) * STRIP, wide = min(STRIP, columns - first), within = n - first * height;
    return (int2)(first + within % wide, within / wide);
#else
    return place;
#endif
}

/* Share of the lobe below a thing at depth z. Its heights above the ray and above the mirroring place are
 * p_r (z - Z0) + z aside and up_r (z - Z0) + z up_aside. */
static inline floatw covers(
    const Walk *k, const Mirrored *m, const floatw z, const Sharp aside, const Sharp up_aside, const float stride)
{
#pragma OPENCL FP_CONTRACT OFF
    const Sharp d = sharp_sum(sharp(z), sharp(-m->Z0));
    const Sharp above = sharp_sum(sharp_times(m->p_r, d), sharp_scaled(aside, z));
    const Sharp higher = sharp_sum(sharp_times(m->up_r, d), sharp_scaled(up_aside, z));
    const floatw q = above.hi + above.lo, h = higher.hi + higher.lo;
    const floatw t = fmax(d.hi, 0.0f) * m->inv_Lz;
    const floatw pixel = z * k->inv_fy;
    const floatw width = fma(m->lobe, t, pixel);
    const floatw thick = fma(pixel, (floatw)stride, (floatw)k->thickness_m), ground = fma(t, (floatw)GROUND_SLOPE, (floatw)GROUND_M);
    const floatw inv = 1.0f / (thick * ground); /* one division for two */
    const floatw cdf = smooth_ramp(0.5f * q / width + 0.5f);
    floatw share = fmax(cdf - m->below, 0.0f) * m->inv_above;
    share *= ramp(fma(thick + width - q, inv * ground * (1.0f / FADE), (floatw)1.0f));
    share *= ramp(fma(h, inv * thick, (floatw)-1.0f));
    return share * ramp(d.hi * m->inv_near) * ramp((k->reach_m - t) * k->inv_reach_fade);
}

/* Whether a thing stands before the mirroring place, so that its rays rise behind it, 0 to 1. */
static inline floatw hides(const Mirrored *m, const floatw z)
{
    const floatw before = m->Z0 - z;
    return ramp(fma(before, m->inv_near, (floatw)-1.0f)) * ramp((HIDDEN_M - before) * (1.0f / (FADE * HIDDEN_M)));
}

typedef struct {
    floatw r, g, b;
} Light;

static inline Light light(__global const float *restrict p, const int apart, const intw at, const int together)
{
    const Light l = {pick(p, at, together), pick(p + apart, at, together), pick(p + 2 * apart, at, together)};
    return l;
}

/* Radiance of things around the middle of a step that ends in row y; `own` where there is none. */
static inline Light mean(
    const Walk *k, const Light own, const int y, const int stride, const intw x, const int together)
{
    if (stride == 1)
        return own;
    const int block = stride <= BLOCK_ROWS[0] ? 0 : stride <= BLOCK_ROWS[1] ? 1 : 2;
    const int rows = BLOCK_ROWS[block], size = (k->height + rows - 1) / rows * k->row;
    __global const float *restrict p = k->means + first_mean(block, k->height, k->row);
    const int middle = 2 * y + stride + rows, above = middle / (2 * rows) - 1, last = size / k->row - 1;
    const float lower = (middle % (2 * rows)) / (2.0f * rows);
    const intw at = max(above, 0) * k->row + x, below = min(above + 1, last) * k->row + x;
    const Light a = light(p, size, at, together), b = light(p, size, below, together);
    const floatw share_a = pick(p + 3 * size, at, together), share_b = pick(p + 3 * size, below, together);
    const floatw inv = 1.0f / (fma((floatw)lower, share_b - share_a, share_a) + OWN);
    Light l;
    l.r = fma((floatw)OWN, own.r, fma((floatw)lower, b.r - a.r, a.r)) * inv;
    l.g = fma((floatw)OWN, own.g, fma((floatw)lower, b.g - a.g, a.g)) * inv;
    l.b = fma((floatw)OWN, own.b, fma((floatw)lower, b.b - a.b, a.b)) * inv;
    return l;
}

/* Whether neither of two depths is of a thing, give or take a rounding: ground, too far off, or, before
 * the mirroring place, too far before it. */
static inline intw nothing(const Walk *k, const Mirrored *m, const floatw d, const floatw h)
{
    return (h <= 0.9f * GROUND_M) & (d >= 0.0f) | (d >= m->reach) | (d <= -HIDDEN_M);
}

static inline Things things(
    const Walk *k, const Mirrored *m, const floatw passed, const int rows, const int stride,
    const int coarse)
{
#pragma OPENCL FP_CONTRACT OFF
    const Sharp shift = sharp_scaled(m->lean, (floatw)(float)-rows);
    const floatw whole = floor(shift.hi), rest = (shift.hi - whole) + shift.lo, more = floor(rest);
    const floatw left = m->u + (whole + more);
    const floatw x = clamp(left, 0.0f, (float)(k->width - 1));
    const intw at = (k->v - rows) * k->row + TOINTW(x);
    const int together = !ANYW(at != FIRST(at) + TOINTW(LANES));
    const floatw z_a = pick(k->pixels, at, together), z_b = pick(k->pixels, at + 1, together);

    const floatw d_a = z_a - m->Z0, d_b = z_b - m->Z0;
    const floatw dx = x - m->u;
    const floatw up_a = fma(dx, k->up_u.hi, -rows * k->up_v.hi), up_b = up_a + k->up_u.hi;
    const floatw h_a = fma(m->up_r.hi, d_a, z_a * up_a), h_b = fma(m->up_r.hi, d_b, z_b * up_b);
    Things f = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 1.0f};
    if (!ANYW(m->on & !(nothing(k, m, d_a, h_a) & nothing(k, m, d_b, h_b))))
        return f;

    const floatw U = m->u + shift.hi;
    const floatw w = ramp((rest - more) + (left - x));
    const floatw inside = ramp(fmin(U, (float)(k->width - 1) - U) * k->inv_edge_u)
        * clamp((float)(k->v - rows) * k->inv_edge_v, 0.0f, 1.0f);
    const Sharp down = sharp_scaled(m->p_v, (floatw)(float)-rows);
    const Sharp aside_a = sharp_sum(sharp_scaled(m->p_u, dx), down), aside_b = sharp_sum(aside_a, m->p_u);
    const Sharp over_a = sharp_sum(sharp_scaled(k->up_u, dx), sharp_scaled(k->up_v, (floatw)(float)-rows));
    const Sharp over_b = sharp_sum(over_a, k->up_u);
    const floatw in_a = (1.0f - w) * inside, in_b = w * inside;
    const floatw own_a = in_a * covers(k, m, z_a, aside_a, over_a, (float)stride);
    const floatw own_b = in_b * covers(k, m, z_b, aside_b, over_b, (float)stride);
    f.up_to = own_a + own_b + fma(in_a, hides(m, z_a), in_b * hides(m, z_b));
    if (!ANYW(m->on & (f.up_to > passed)))
        return f;

    const floatw inv = 1.0f / fmax(f.up_to, 1e-30f), part_a = own_a * inv, part_b = own_b * inv;
    const Light one = light(k->pixels + k->apart, k->apart, at, together);
    const Light two = light(k->pixels + k->apart, k->apart, at + 1, together);
    f.r = fma(part_a, one.r, part_b * two.r);
    f.g = fma(part_a, one.g, part_b * two.g);
    f.b = fma(part_a, one.b, part_b * two.b);
    if (coarse) {
        const Light mean_one = mean(k, one, k->v - rows, stride, TOINTW(x), together);
        const Light mean_two = mean(k, two, k->v - rows, stride, TOINTW(x) + 1, together);
        f.mean_r = fma(part_a, mean_one.r, part_b * mean_two.r);
        f.mean_g = fma(part_a, mean_one.g, part_b * mean_two.g);
        f.mean_b = fma(part_a, mean_one.b, part_b * mean_two.b);
    }
    f.own = part_a + part_b;
    const floatw t_a = fmax(d_a, 0.0f) / z_a, t_b = fmax(d_b, 0.0f) / z_b;
    f.wide = fma(m->lobe * m->inv_Lz * k->fy, fma(w, t_b - t_a, t_a), (floatw)1.0f);
    return f;
}

static inline void add(Seen *s, const floatw r, const floatw g, const floatw b, const floatw own, const floatw share)
{
    s->r = fma(share, r, s->r);
    s->g = fma(share, g, s->g);
    s->b = fma(share, b, s->b);
    s->own = fma(share, own, s->own);
}

/* Rows that are walked again in FINER parts: those up to `row`, where `end` was found, which covers the lobe up to `to`. */
typedef struct {
    int start, row, part;
    Things end;
    floatw to;
} Again;

/* Up the line; where a step covers some of the lobe, again in parts of it, and in parts of the parts that do. One loop for
 * all three, since the compiler copies what is called to every place that calls it. */
static inline Seen walk(const Walk *k, const Mirrored *m, const int steps)
{
    Seen s = {0.0f, 0.0f, 0.0f, 0.0f};
    Again again[3];
    floatw passed = 0.0f, finer = 0.0f;
    int level = 0, step = 0, before = 0, stride = 0;
    while (ANYW(m->on & (passed < 1.0f) & (m->last > (float)before))) {
        int row;
        if (level == 0) {
            if (++step > steps)
                break;
            row = (step * step * k->v + steps * steps - 1) / (steps * steps);
            stride = row - before;
        } else {
            const Again a = again[level];
            again[level].part++;
            row = a.start + ((a.part + 1) * (a.row - a.start) + FINER - 1) / FINER;
        }
        if (row == before)
            continue;
        const Things f = level > 0 && row == again[level].row ? again[level].end : things(k, m, passed, row, stride, level == 0);
        const floatw to = level > 0 ? clamp(f.up_to, passed, again[level].to) : fmax(f.up_to, passed);
        const intw more = m->on & (to > passed);
        if (ANYW(more)) {
            if (level == 0) {
                finer = stride > 1 ? ramp(2.0f - f.wide * (2.0f / stride)) : (floatw)0.0f;
                add(&s, f.mean_r, f.mean_g, f.mean_b, f.own, SELECTW(more, (1.0f - finer) * (to - passed), 0.0f));
            }
            const intw rest = more & (finer > 0.0f);
            if (level < 2 && row - before > 1 && ANYW(rest)) {
                level++;
                again[level].start = before;
                again[level].row = row;
                again[level].part = 0;
                again[level].end = f;
                again[level].to = SELECTW(more, to, passed);
                continue;
            }
            add(&s, f.r, f.g, f.b, f.own, SELECTW(rest, finer * (to - passed), 0.0f));
            passed = SELECTW(more, to, passed);
        }
        before = row;
        while (level > 0 && row == again[level].row)
            level--;
    }
    return s;
}

/* Rays of the line of sight (kx, ky, 1), mirrored at normals that need not be of length 1. */
static inline Mirrored mirrored(
    const floatw nx, const floatw ny, const floatw nz, const floatw Z0, const floatw u, const float v,
    const floatw roughness, const float fx, const float fy, const float cx, const float cy, const float3 up,
    floatw *fit, floatw *sine)
{
#pragma OPENCL FP_CONTRACT OFF
    Mirrored m;
    m.u = u;
    m.Z0 = Z0;
    m.inv_near = 1.0f / (NEAR * Z0);
    const Sharp du = sharp_sum(sharp(u), sharp(-cx)), dv = sharp_sum(sharp(v), sharp(-cy));
    const Sharp by_fx = inverse(fx), by_fy = inverse(fy);
    const Sharp kx = sharp_times(du, by_fx), ky = sharp_times(dv, by_fy);
    const Sharp rr = sharp_sum(sharp_sum(sharp_times(kx, kx), sharp_times(ky, ky)), sharp(1.0f));
    const Sharp S = sharp_sum(sharp_sum(sharp_scaled(kx, nx), sharp_scaled(ky, ny)), sharp(nz));
    const Sharp nn = sharp_sum(
        sharp_sum(sharp_scaled(sharp(nx), nx), sharp_scaled(sharp(ny), ny)), sharp_scaled(sharp(nz), nz));
    const Sharp over = sharp_quotient(sharp_times(S, S), nn), minus = {-over.hi, -over.lo};
    const Sharp rest = sharp_sum(rr, minus), along = sharp_sum(rest, minus);
    const floatw inv_n = 1.0f / sqrt(nn.hi), inv_r = 1.0f / sqrt(rr.hi);
    *sine = clamp(-S.hi * inv_n * inv_r, MIN_NOV, 1.0f);
    const floatw cosine = fmax(sqrt(fmax(rest.hi, 0.0f)) * inv_r, MIN_COSINE);
    const floatw unit = inv_n * inv_r * inv_r / cosine;
    m.p_r = sharp_scaled(sharp_times(S, rest), 2.0f * unit);
    const Sharp px = sharp_sum(sharp_scaled(along, nx), sharp_times(S, kx));
    const Sharp py = sharp_sum(sharp_scaled(along, ny), sharp_times(S, ky));
    m.p_u = sharp_scaled(sharp_times(px, by_fx), unit);
    m.p_v = sharp_scaled(sharp_times(py, by_fy), unit);
    m.up_r = sharp_sum(sharp_sum(sharp_scaled(kx, up.x), sharp_scaled(ky, up.y)), sharp(up.z));

    const Sharp across = sharp_sum(sharp_scaled(sharp(nx), fx), sharp_scaled(du, -nz));
    const Sharp down = sharp_sum(sharp_scaled(sharp(ny), fy), sharp_scaled(dv, -nz));
    const floatw rise = -down.hi * inv_n / fy, Lz = fma(2.0f * *sine * inv_n, nz, inv_r);
    const intw steep = rise >= MIN_RISE;
    const Sharp safe = {SELECTW(steep, down.hi, -1.0f), SELECTW(steep, down.lo, 0.0f)};
    m.lean = sharp_quotient(across, safe);
    m.lean.hi = SELECTW(steep, m.lean.hi, 0.0f);
    m.lean.lo = SELECTW(steep, m.lean.lo, 0.0f);
    m.inv_Lz = 1.0f / fmax(Lz, MIN_AHEAD);
    *fit = smooth_ramp(rise * (1.0f / MIN_RISE) - 1.0f) * smooth_ramp(2.0f - 2.0f * fabs(m.lean.hi))
        * smooth_ramp(Lz * (1.0f / MIN_AHEAD) - 1.0f);
    m.lobe = LOBE * roughness * roughness;
    m.below = smooth_ramp(0.5f - 0.5f * *sine / (cosine * fmax(m.lobe, 1e-6f)));
    m.inv_above = 1.0f / (1.0f - m.below);
    return m;
}

/* The lobes that stand for the reflection's as one: shares A and B of the parts of Schlick's Fresnel term, and turn and
 * roughness in the mean. */
static inline void mean_lobe(
    __global const float *restrict env_brdf, const Corner at, const floatw F0,
    floatw *A, floatw *B, floatw *turn, floatw *roughness)
{
    floatw share[2] = {0.0f, 0.0f}, turned = 0.0f, rough = 0.0f;
    for (int k = 0; k < LOBES; k++) {
        const Quad lobe = bilinear(env_brdf, at, LOBES, k);
        const floatw weight = k < LOBES_F0 ? F0 * lobe.x : lobe.x;
        share[k >= LOBES_F0] += lobe.x;
        turned = fma(weight, lobe.y, turned);
        rough = fma(weight, lobe.z, rough);
    }
    const floatw inv = 1.0f / fma(F0, share[0], share[1]);
    *A = share[0];
    *B = share[1];
    *turn = turned * inv;
    *roughness = rough * inv;
}

__kernel void reflections(
    __global float *restrict rgb,                       /* scene-linear */
    __global const float *restrict reflection_pixels,
    __global const float *restrict reflection_means,
    __global const float *restrict depth,               /* [m] */
    __global const float *restrict normal,
    __global const float *restrict albedo,
    __global const float *restrict roughness,
    __global const float *restrict metallic,
    __global const uchar *restrict sky,
    __global const float *restrict puddle,
    __global const float *restrict wetness,
    __global const float *restrict occlusion,
#ifdef LAYERS
    __global float *restrict reflection,
#endif
    const int width, const int height,                  /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    __global const float *restrict up,                  /* the world's, camera frame */
    __global const float *restrict env_rotation,        /* camera to world */
    __global const float *restrict env_specular,
    __global const float *restrict env_brdf,
    const int env_levels, const int env_size, const int env_brdf_size,
    const int steps,
    const float reach_m,                                /* [m] */
    const float thickness_m,                            /* [m] */
    const float max_roughness)
{
    const int2 place = down_strips(height);
    const int u0 = place.x * W, v = place.y;
    const int i = v * pitch + u0;
#ifdef LAYERS
    STOREW((floatw)0.0f, reflection + i);
    STOREW((floatw)0.0f, reflection + i + plane);
    STOREW((floatw)0.0f, reflection + i + 2 * plane);
#endif
    const floatw wet = ramp(fmax(LOADW(puddle + i), LOADW(wetness + i)) * (1.0f / WET));
    if (!ANYW(wet > 0.0f))
        return;
    const floatw rough = LOADW(roughness + i);
    const intw on = (wet > 0.0f) & (rough < max_roughness) & !LOADMASKW(sky + i);
    if (!ANYW(on))
        return;

    floatw fit, NoV;
    const floatw n0 = LOADW(normal + i), n1 = LOADW(normal + i + plane), n2 = LOADW(normal + i + 2 * plane);
    const intw whole = fma(n0, n0, fma(n1, n1, n2 * n2)) > 1e-12f;
    const floatw nx = SELECTW(whole, n0, 0.0f), ny = SELECTW(whole, n1, 0.0f), nz = SELECTW(whole, n2, -1.0f);
    const float3 upward = vload3(0, up);
    const floatw u = (float)u0 + LANES;
    Mirrored m = mirrored(
        nx, ny, nz, fmin(LOADW(depth + i), NOTHING), u, (float)v, rough, fx, fy, cx, cy, upward, &fit, &NoV);
    const floatw weight = wet * smooth_ramp((max_roughness - rough) / (SMOOTH * max_roughness)) * fit;
    m.on = on & (weight > 0.0f);
    Walk k;
    k.pixels = reflection_pixels;
    k.means = reflection_means;
    k.height = height;
    k.row = pitch + 1;
    k.apart = height * k.row;
    k.width = width;
    k.fy = fy;
    k.inv_fy = 1.0f / fy;
    k.inv_edge_u = 1.0f / (EDGE * width);
    k.inv_edge_v = 1.0f / (EDGE * height);
    k.reach_m = reach_m;
    k.inv_reach_fade = 1.0f / (FADE * reach_m);
    k.thickness_m = thickness_m;
    k.up_u = sharp_scaled(inverse(fx), upward.x);
    k.up_v = sharp_scaled(inverse(fy), upward.y);
    k.v = v;
    m.reach = reach_m / m.inv_Lz;
    /* A thing q above the ray is z (p.r) - Z0 (p.r0) with p.r of its own line of sight, which grows by the row; none counts
     * above the lobe, what it reaches down and what a step may miss. A row and a column are added for rounding. */
    const floatw climb = fma(-m.lean.hi, m.p_u.hi, -m.p_v.hi);
    const floatw top = fma(m.lobe, m.inv_Lz, (2.5f * (v / steps + 3) + 4.0f) * k.inv_fy);
    const intw above = (climb > 0.0f) & (-m.p_r.hi * m.Z0 > (1.0f + FADE) * thickness_m);
    m.last = SELECTW(above, (top + 2.0f * fabs(m.p_u.hi) - m.p_r.hi) / climb, (float)height);
    const Seen s = walk(&k, &m, steps);
    const intw changed = m.on & (s.own > 0.0f);
#ifndef LAYERS
    if (!ANYW(changed))
        return;
#endif

    const floatw cr = clamp(LOADW(albedo + i), 0.0f, 1.0f);
    const floatw cg = clamp(LOADW(albedo + i + plane), 0.0f, 1.0f);
    const floatw cb = clamp(LOADW(albedo + i + 2 * plane), 0.0f, 1.0f);
    const floatw metal = LOADW(metallic + i);
    const floatw fr = fma(cr - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    const floatw fg = fma(cg - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    const floatw fb = fma(cb - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    floatw A, B, turn, lobe_rough, X, Y, Z;
    mean_lobe(
        env_brdf, lobe_corner(NoV, rough, env_brdf_size), (fr + fg + fb) * (1.0f / 3.0f), &A, &B, &turn, &lobe_rough);
    const floatw unit = 1.0f / sqrt(fma(nx, nx, fma(ny, ny, nz * nz))), to_n = fma(1.0f - turn, 2.0f * NoV, turn) * unit;
    const floatw kx = (u - cx) / fx;
    const float ky = ((float)v - cy) / fy;
    const floatw ahead = (1.0f - turn) / sqrt(fma(kx, kx, fma(ky, ky, 1.0f)));
    to_world(env_rotation, fma(to_n, nx, ahead * kx), fma(to_n, ny, ahead * ky), fma(to_n, nz, ahead), &X, &Y, &Z);
    const Quad around = prefiltered(env_specular, env_levels, env_size, X, Y, Z, lobe_rough);
    const floatw open = specular_occlusion(NoV, LOADW(occlusion + i), rough), taken = s.own * open;
    const floatw by_r = weight * fma(fr, A, B), by_g = weight * fma(fg, A, B), by_b = weight * fma(fb, A, B);
    const floatw r = LOADW(rgb + i), g = LOADW(rgb + i + plane), b = LOADW(rgb + i + 2 * plane);
    STOREW(SELECTW(changed, fmax(fma(by_r, fma(-taken, around.x, s.r), r), 0.0f), r), rgb + i);
    STOREW(SELECTW(changed, fmax(fma(by_g, fma(-taken, around.y, s.g), g), 0.0f), g), rgb + i + plane);
    STOREW(SELECTW(changed, fmax(fma(by_b, fma(-taken, around.z, s.b), b), 0.0f), b), rgb + i + 2 * plane);
#ifdef LAYERS
    const floatw left = open - taken;
    STOREW(SELECTW(m.on, by_r * fma(left, around.x, s.r), 0.0f), reflection + i);
    STOREW(SELECTW(m.on, by_g * fma(left, around.y, s.g), 0.0f), reflection + i + plane);
    STOREW(SELECTW(m.on, by_b * fma(left, around.z, s.b), 0.0f), reflection + i + 2 * plane);
#endif
}
