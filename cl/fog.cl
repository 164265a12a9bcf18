/* fog.cl - single scattering in a homogeneous medium. Mirrors reference_numpy/fog.py. Paper, supp. "Fog modeling".
 *
 * Two stages: fog_tiles finds the lights that show in the air before a tile's surfaces; fog adds them up.
 *
 * A lane is a pixel, a work-item W pixels of one row. Per light the ray's stretch inside reach and cone is an interval of
 * the scattering angle a. Its ends and the nodes between are vectors along (cos(a/2), sin(a/2)) of any length: sums, products
 * and cross products of them take the place of angles, and no digits are lost where a nears 0 or pi. At the node (c, s), with
 * D the lamp's distance from the ray and N = c^2 + s^2:
 *     r = D N / (2 s c)        lamp to node [m]
 *     x + r = t0 + D s / c     eye to node to lamp [m]
 */
#include "include/bundle.h"
#include "include/exp.h"
#include "include/lamp.h"
#include "include/phase.h"
#include "include/tiles.h"
#include "include/vec.h"

#define PAPER 1          /* convention */
#define NONE -1          /* no light */
#define PIECES 16        /* of a stretch, each of about the same angle at the lamp */

/* The printed in-scatter: phase and attenuated light at the surface at range s. */
static inline floatw at_surface(const Lamp lamp, const floatw x, const floatw y, const floatw z, const floatw s, const float g)
{
    const floatw vx = fma(x, s, -lamp.px), vy = fma(y, s, -lamp.py), vz = fma(z, s, -lamp.pz);
    const floatw r2 = fma(vx, vx, fma(vy, vy, fma(vz, vz, EPSILON)));
    const floatw inv = 1.0f / sqrt(r2);
    const floatw mu = -fma(x, vx, fma(y, vy, z * vz)) * inv;
    floatw light = henyey_greenstein(mu, g) * window(fmax(fma(-r2, lamp.inv_reach * lamp.inv_reach, 1.0f), 0.0f)) / r2;
    if (lamp.cos_outer >= 0.0f)
        light *= cone((fma(vx, lamp.dx, fma(vy, lamp.dy, vz * lamp.dz)) * inv - lamp.cos_outer) * lamp.inv_cone);
    return light;
}

/* A pixel's ray (kx, ky, 1) before it is normalised, and what rounding took off it. */
typedef struct {
    floatw kx, kx_lo;
    float ky, ky_lo;
} Ray;

/* An end of the stretch: a vector along (cos(a/2), sin(a/2)), and for a spot its cross products with the vectors of the
 * cone's two sides: from the side where a is least, and to the other. */
typedef struct {
    floatw c, s, low, high;
} End;

static inline End scaled(const End h, const floatw by)
{
    const End out = {h.c * by, h.s * by, h.low * by, h.high * by};
    return out;
}

/* What the nodes of one ray and one light have in common: the nodes are middle -+ x way, way being half the chord. */
typedef struct {
    End middle, way;
    float stretched;     /* (1 + g)^2 / (1 - g)^2 */
    floatw half_D;       /* D / (2 r_max) */
    float fade;          /* -2 sigma_t r_max, */
    floatw fade_t0;      /* -sigma_t t0: exponents of 2 */
    bool spot;
    intw lit;            /* rays that have a stretch */
    floatw turn, inv_D;  /* the chord's measure, and 1 / D */
    int light;           /* its number, or NONE */
    float3 E;            /* what a ray's glow is multiplied by */
} Stretch;

/* Phase function times light times da at a node (c, s), but for factors that all nodes share. With
 * Q = c^2 + ((1 + g) / (1 - g))^2 s^2 ~ N (1 + g^2 - 2 g cos(a)) they are Q^-1.5 N^1.5, S W exp(..) and 1 / N; S is a square
 * of cos - cos_outer = sides / N, which makes it (N Q)^-1.5. No clamp at 0 where rounding alone goes below: S and W are
 * squares. */
static inline floatw node(const Stretch a, const floatw c, const floatw s, const floatw sides)
{
    const floatw c2 = c * c, s2 = s * s, N = c2 + s2;
    const floatw inv = a.half_D / (s * c);
    const floatw r = N * inv; /* of r_max */
    const floatw q = r * r;
    const floatw w = (a.spot ? min(sides, N) : N) * fma(-q, q, 1.0f); /* distance window W is a square, too */
    const floatw NQ = N * fma(a.stretched, s2, c2);
    return w * w * exp2_negative(fma(a.fade * s2, inv, a.fade_t0)) / (NQ * sqrt(NQ));
}

/* Gauss-Legendre along the chord between the stretch's ends. */
static inline floatw quadrature(
    const Stretch a,
    __global const float *restrict node_x, __global const float *restrict node_w, const int node_pairs)
{
    const End m = a.middle;
    floatw total = 0.0f;
    for (int i = 0; i < node_pairs; i++) {
        const End d = scaled(a.way, (floatw)node_x[i]);
        const floatw before = node(a, m.c - d.c, m.s - d.s, (m.low - d.low) * (m.high - d.high));
        const floatw after = node(a, m.c + d.c, m.s + d.s, (m.low + d.low) * (m.high + d.high));
        total = fma(node_w[i], before + after, total);
    }
    return total;
}

/* Component of a spot's axis along the way from the ray's closest approach to the lamp, times the distance D: no digits are
 * lost where D << |position|. */
static inline floatw axis_across(
    const Lamp lamp, const floatw x, const floatw y, const floatw z, const floatw ax, const floatw ay, const floatw az)
{
    return -((y * az - z * ay) * lamp.dx + (z * ax - x * az) * lamp.dy + (x * ay - y * ax) * lamp.dz);
}

/* The vector along (cos(a/2), sin(a/2)) to (x, y), y >= 0, at angle a and distance r. */
static inline End halved(const floatw x, const floatw y, const floatw r)
{
    const floatw p = r + fabs(x);
    const intw past = x < 0.0f;
    const End h = {SELECTW(past, y, p), SELECTW(past, p, y), 0.0f, 0.0f};
    return h;
}

static inline floatw cross_product(const End a, const End b)
{
    return fma(a.c, b.s, -a.s * b.c);
}

/* a cut, where it holds, b else. */
static inline End either(const intw cut, const End a, const End b)
{
    const End out = {SELECTW(cut, a.c, b.c), SELECTW(cut, a.s, b.s), SELECTW(cut, a.low, b.low), SELECTW(cut, a.high, b.high)};
    return out;
}

/* Ends of a stretch, and the cross product from the first to the last. */
typedef struct {
    End first, last;
    floatw turn;
} Ends;

/* The stretch within a spot's cone. (c, k / D) are the axis' components along the ray and across it, inside is root^2 =
 * D^2 (R^2 - cos_outer^2), R D = length: the cone's middle is at the angle of (-c D, k), its half angle that of
 * (cos_outer D, root). */
static inline Ends within_cone(
    const Ends all, const floatw c, const floatw k, const floatw D, const floatw root, const floatw length, const float cos_outer)
{
    const End m = halved(-c * D, k, length);
    const End h = {length + cos_outer * D, root, 0.0f, 0.0f};
    const floatw cc = m.c * h.c, ss = m.s * h.s, sc = m.s * h.c, cs = m.c * h.s;
    End low = {cc + ss, sc - cs, 0.0f, 0.0f}, high = {cc - ss, sc + cs, 0.0f, 0.0f};
    /* across the cone: |m|^2 2 sin cos of half its half angle, |m|^2 by its own form */
    low.high = 2.0f * fma(m.c, m.c, m.s * m.s) * h.c * h.s;
    high.low = low.high;
    End first = all.first, last = all.last;
    first.low = cross_product(low, first); first.high = cross_product(first, high);
    last.low = cross_product(low, last); last.high = cross_product(last, high);
    const intw begun = first.low < 0.0f, ended = last.high < 0.0f; /* at the cone's sides */
    Ends cut;
    cut.turn = SELECTW(ended, SELECTW(begun, low.high, first.high), SELECTW(begun, last.low, all.turn));
    first.high = SELECTW(begun, low.high, first.high);
    cut.first = either(begun, low, first);
    cut.last = either(ended, high, last);
    return cut;
}

/* A lamp's stretch of the rays (x, y, z), and whether any of them has one. */
static inline bool find_stretch(
    const Lamp lamp, const float r_max, const Ray ray, const floatw x, const floatw y, const floatw z, const floatw s,
    const float extinction, const float g, Stretch *stretch)
{
    const floatw t0 = fma(x, lamp.px, fma(y, lamp.py, z * lamp.pz));
    /* across = position x ray, of the ray before it was normalised and with what rounding took off it: where the lamp is far
     * and the ray passes near, a rounded ray would miss the lamp's true distance from it. */
    const floatw wx = lamp.py * ray.kx;
    const floatw ax = z * (fma(-lamp.pz, ray.ky, lamp.py) - lamp.pz * ray.ky_lo);
    const floatw ay = z * (fma(lamp.pz, ray.kx, -lamp.px) + lamp.pz * ray.kx_lo);
    const floatw az = z * (fma(lamp.px, ray.ky, -wx) - fma(lamp.py, ray.kx, -wx) + fma(lamp.px, ray.ky_lo, -lamp.py * ray.kx_lo));
    const floatw D2 = fma(ax, ax, fma(ay, ay, fma(az, az, EPSILON)));
    const floatw reach2 = r_max * r_max - D2;
    const bool spot = lamp.cos_outer >= 0.0f;
    intw lit = reach2 > 0.0f;
    floatw c = 0.0f, inside = 0.0f;
    if (spot) {
        /* The cosine to the spot's axis at angle a is k sin(a) + |c| cos(a) = R cos(a - middle), and the ray meets the cone
         * where R^2 > cos_outer^2; inside is D^2 times the difference. A narrow cone's R is near 1: there R^2 = 1 - m^2 / D^2,
         * with m the axis' component along `across`, keeps the digits that decide a grazing ray. */
        c = fma(x, lamp.dx, fma(y, lamp.dy, z * lamp.dz));
        if (lamp.cos_outer > M_SQRT1_2_F) {
            const floatw m = fma(ax, lamp.dx, fma(ay, lamp.dy, az * lamp.dz));
            inside = fma(lamp.sin2_outer, D2, -m * m) - EPSILON * fma(-c, c, 1.0f);
        } else {
            const floatw k = axis_across(lamp, x, y, z, ax, ay, az);
            inside = fma(fma(c, c, -lamp.cos_outer * lamp.cos_outer), D2, k * k);
        }
        lit &= inside > 0.0f;
    }
    const floatw reach = sqrt(fmax(reach2, 0.0f)); /* along the ray, on both sides of its closest approach */
    lit &= (t0 - s < reach) & (t0 > -reach);
    const floatw near = min(t0, reach), far = max(t0 - s, -reach);
    if (!ANYW(lit))
        return false;

    const floatw inv_D = RSQRTW(D2), D = D2 * inv_D;
    const floatw r_near = sqrt(fma(near, near, D2)), r_far = sqrt(fma(far, far, D2));
    Ends ends;
    ends.first = halved(near, D, r_near);
    ends.last = halved(far, D, r_far);
    /* the sine of half the angle that the stretch subtends from its length: a short one would be lost between two angles */
    const floatw length = SELECTW((near == t0) & (far == t0 - s), s, near - far);
    ends.turn = length * fma(ends.first.c, ends.last.s, ends.first.s * ends.last.c) / (r_near + r_far);
    floatw gain = 1.0f;
    if (spot) {
        const floatw k = axis_across(lamp, x, y, z, ax, ay, az);
        const floatw root = sqrt(fmax(inside, 0.0f));
        const floatw RD = sqrt(fma(lamp.cos_outer * lamp.cos_outer, D2, fmax(inside, 0.0f)));
        ends = within_cone(ends, c, k, D, root, RD, lamp.cos_outer);
        /* cos - cos_outer = 2 R sin(..) sin(..) of half the angles to the cone's sides; their vectors' squared length: */
        const floatw sides = (RD + fabs(c) * D) * (RD + lamp.cos_outer * D);
        gain = 0.5f * lamp.inv_cone * inv_D / (RD * sides);
    }
    lit &= ends.turn > 0.0f;
    if (!ANYW(lit))
        return false;

    Stretch a;
    a.stretched = (1.0f + g) * (1.0f + g) / ((1.0f - g) * (1.0f - g));
    const floatw by_first = RSQRTW(fma(a.stretched, ends.first.s * ends.first.s, ends.first.c * ends.first.c));
    const floatw by_last = RSQRTW(fma(a.stretched, ends.last.s * ends.last.s, ends.last.c * ends.last.c));
    End first = scaled(ends.first, 0.5f * by_first), last = scaled(ends.last, 0.5f * by_last);
    first.low *= gain; last.low *= gain;
    a.middle.c = last.c + first.c; a.way.c = last.c - first.c;
    a.middle.s = last.s + first.s; a.way.s = last.s - first.s;
    a.middle.low = last.low + first.low; a.way.low = last.low - first.low;
    a.middle.high = last.high + first.high; a.way.high = last.high - first.high;
    a.half_D = 0.5f * D * lamp.inv_reach;
    a.fade = -2.0f * M_LOG2E_F * extinction * r_max;
    a.fade_t0 = -M_LOG2E_F * extinction * t0;
    a.spot = spot;
    a.lit = lit;
    a.turn = ends.turn * by_first * by_last;
    a.inv_D = inv_D;
    *stretch = a;
    return true;
}

/* The single-scattering integral along a stretch, all but what is too faint. */
static inline floatw glow_along(
    const Stretch a, const float g, const float air_floor,
    __global const float *restrict node_x, __global const float *restrict node_w, const int node_pairs)
{
    const floatw total = quadrature(a, node_x, node_w, node_pairs);
    const float scale = phase_scale(g) / ((1.0f - g) * (1.0f - g) * (1.0f - g));
    const floatw glow = SELECTW(a.lit, total * a.turn * a.inv_D * scale, 0.0f);
    const floatw faint = air_floor / glow; /* 1 at the floor; any number over it where nothing glows */
    const floatw left = fmax(fma(-faint, faint, 1.0f), 0.0f), left2 = left * left;
    return glow * left2 * left2;
}

/* No less than phase, S, W and 1 / r^2 of any ray of the bundle along its places from y0 to y1, integrated. */
static inline floatw most_of(const Bundle b, const Met m, const Lamp lamp, const float g, const floatw y0, const floatw y1)
{
    const floatw D2 = m.D * m.D;
    const floatw beside = clamp((floatw)0.0f, y0, y1), nearest = sqrt(fma(beside, beside, D2));
    const floatw off = fma(b.half_angle, m.t0 + y1, ROUNDING * (fabs(m.t0) + y1 - y0));
    const floatw r = nearest - off, inv = 1.0f / r;
    const floatw end = g > 0.0f ? -y0 : y1; /* where the phase function is highest */
    const floatw cosine = fma(2.0f * off, inv, end * RSQRTW(fma(end, end, D2)) + b.half_angle);
    const floatw q = fma(-2.0f * fabs(g), fmin(cosine, 1.0f), fma(g, g, 1.0f));
    const floatw near = r * lamp.inv_reach, near2 = near * near;
    floatw light = fmax(fma(-near2, near2, 1.0f), 0.0f);
    if (lamp.cos_outer >= 0.0f) {
        const floatw at = clamp(m.top, y0, y1);
        const floatw over = fma(m.rise, at, m.h) - lamp.cos_outer * sqrt(fma(at, at, D2));
        light *= clamp(over * inv * lamp.inv_cone, 0.0f, 1.0f);
    }
    return SELECTW(r > 0.5f * nearest, light * light * (y1 - y0) * inv * inv / (q * sqrt(q)), INFINITY);
}

/* No less than the single scattering of a lamp of unit intensity along any ray of the bundle [1/(m sr)]. */
static inline floatw most_glow(const Bundle b, const Lamp lamp, const float r_max, const float extinction, const float g)
{
    const Met m = met_by(b, lamp, r_max);
    const intw met = m.first < m.last;
    if (!ANYW(met))
        return 0.0f;
    const floatw by_first = RSQRTW(fma(m.first, m.first, m.D * m.D)), by_last = RSQRTW(fma(m.last, m.last, m.D * m.D));
    floatw total = 0.0f, y0 = m.first;
    for (int i = 1; i <= PIECES; i++) {
        const float along = i * (1.0f / PIECES);
        const floatw a = (1.0f - along) * by_first, b1 = along * by_last, y1 = fma(a, m.first, b1 * m.last) / (a + b1);
        total += most_of(b, m, lamp, g, y0, y1);
        y0 = y1;
    }
    const float faded = 1.01f * phase_scale(g) * exp(-extinction * length((float3)(lamp.px, lamp.py, lamp.pz)));
    return SELECTW(met, faded * total, 0.0f);
}

/* Whether what a lamp sends to the eye, by however short a way, fades to under 1e-40: exp_negative ends at 1e-38. */
static inline bool fades_out(const float3 lamp, const float extinction)
{
    return extinction * extinction * dot(lamp, lamp) > 92.0f * 92.0f;
}

__kernel void fog_tiles(
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
    __global uint *restrict tile_lights,                /* a bit a light, (light_count + 31) / 32 words a tile */
    const int width, const int height, const int pitch, /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,      /* [m] camera frame */
    __global const float *restrict light_direction,
    __global const float *restrict light_r_max,         /* [m] */
    __global const float *restrict light_air_floor,     /* [1/(m sr)] single scattering under which nothing is taken */
    __global const float *restrict light_shape,         /* cos_outer, its sine squared, 1 / (cos_inner - cos_outer), 1 / r_max */
    __global const float *restrict light_ball,          /* [m] centre and radius of what a lamp can light */
    const float sigma_s, const float sigma_a,           /* [1/m] */
    const float alpha,
    const float g,
    const float extent_m,                               /* [m] */
    const int convention)
{
    const float extinction = alpha * (sigma_s + sigma_a);
    const int words = (light_count + 31) / 32, columns = (width + TILE - 1) / TILE, first = get_global_id(0) * W;
    __global uint *restrict row = tile_lights + words * columns * get_global_id(1);
    Frusta tiles = frusta(depth, sky, extent_m, pitch, height, first * TILE, get_global_id(1) * TILE, fx, fy, cx, cy);
    tiles.near = 0.0f; /* the air before the surfaces is lit, too */
    const Bundle rays = bundle(tiles);
    for (int word = 0; word < words; word++) {
        uintw bits = 0;
        for (int l = 32 * word; l < min(32 * word + 32, light_count); l++) {
            intw lit = meets(tiles, vload4(l, light_ball));
            const bool placed = light_kind[l] != DIRECTIONAL && convention != PAPER;
            if (!ANYW(lit) || light_air_floor[l] == INFINITY || (placed && fades_out(vload3(l, light_position), extinction)))
                continue;
            if (placed) {
                const Lamp source = lamp(l, light_position, light_direction, light_shape);
                lit &= !(most_glow(rays, source, light_r_max[l], extinction, g) <= light_air_floor[l]);
            }
            bits |= bit_of(l, lit);
        }
        store_word(bits, row, first, columns, word, words);
    }
}

/* Single scattering of all lamps, a colour each. */
typedef struct {
    floatw r, g, b;
} Glow;

static inline void add(Glow *sum, const floatw glow, const float3 E)
{
    sum->r = fma(glow, E.x, sum->r);
    sum->g = fma(glow, E.y, sum->g);
    sum->b = fma(glow, E.z, sum->b);
}

__kernel void fog(
    __global float *restrict rgb,                       /* scene-linear; edited in place */
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
    __global const uint *restrict tile_lights,
#ifdef LAYERS
    __global float *restrict transmittance,
    __global float *restrict in_scatter,
    __global float *restrict airlight,
#endif
    const int width,                                    /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,      /* [m] camera frame */
    __global const float *restrict light_direction,
    __global const float *restrict light_intensity,
    __global const float *restrict light_r_max,         /* [m] */
    __global const float *restrict light_air_floor,     /* [1/(m sr)] single scattering under which nothing is taken */
    __global const float *restrict light_shape,         /* cos_outer, its sine squared, 1 / (cos_inner - cos_outer), 1 / r_max */
    __global const float *restrict node_x,              /* upper half of the abscissae on [-1, 1] */
    __global const float *restrict node_w,
    const int node_pairs,
    const float sigma_s, const float sigma_a,           /* [1/m] */
    const float alpha,
    const float g,
    const float gamma,
    const float beta,
    const float3 color,
    const float extent_m,                               /* [m] */
    const int convention)
{
    const int u0 = get_global_id(0) * W;
    const int v = get_global_id(1);
    const int i = v * pitch + u0;
    const int words = (light_count + 31) / 32;
    __global const uint *restrict reaching = tile_lights + words * (v / TILE * ((width + TILE - 1) / TILE) + u0 / TILE);

    const floatw column = (float)u0 + LANES, du = column - cx;
    const float dv = (float)v - cy;
    const float row_c = dv - (float)v, row_off = ((float)v - (dv - row_c)) - (cy + row_c);
    Ray ray;
    ray.kx = du / fx;
    ray.ky = dv / fy;
    ray.kx_lo = (fma(-ray.kx, fx, du) + off_difference(column, cx, du)) / fx;
    ray.ky_lo = (fma(-ray.ky, fy, dv) + row_off) / fy;
    const floatw stretch = sqrt(fma(ray.kx, ray.kx, fma(ray.ky, ray.ky, 1.0f)));
    const floatw z = 1.0f / stretch;
    const floatw x = ray.kx * z, y = ray.ky * z;

    floatw s = fmin(LOADW(depth + i) * stretch, extent_m);
    if (convention != PAPER)
        s = SELECTW(LOADMASKW(sky + i), extent_m, s);

    const float scattering = alpha * sigma_s, strength = gamma * scattering;
    const float extinction = alpha * (sigma_s + sigma_a);
    const floatw half_way = exp_negative(-0.5f * extinction * s); /* its square underflows long before what it leaves of 1e5 does */
    const floatw T = half_way * half_way;
    const floatw opacity = one_minus_exp(extinction * s, T);

    Glow sum = {0.0f, 0.0f, 0.0f};
    Stretch found, next;
    found.light = NONE;
    for (int word = 0; word < words; word++) {
        for (uint bits = reaching[word]; bits; bits &= bits - 1) {
            const int l = lowest(word, bits);
            const float3 E = vload3(l, light_intensity) * strength;
            const Lamp source = lamp(l, light_position, light_direction, light_shape);
            if (light_kind[l] == DIRECTIONAL) {
                const floatw mu = -fma(x, source.dx, fma(y, source.dy, z * source.dz));
                const floatw along = extinction > 0.0f ? opacity / extinction : s;
                add(&sum, henyey_greenstein(mu, g) * (convention == PAPER ? (floatw)(1.0f) : along), E);
            } else if (convention == PAPER) {
                add(&sum, at_surface(source, x, y, z, s, g), E);
            } else if (find_stretch(source, light_r_max[l], ray, x, y, z, s, extinction, g, &next)) {
                /* A stretch is found step by step, each waiting for the one before: meanwhile nodes of the last one are summed. */
                if (found.light != NONE)
                    add(&sum, glow_along(found, g, light_air_floor[found.light], node_x, node_w, node_pairs), found.E);
                found = next;
                found.light = l; found.E = E;
            }
        }
    }
    if (found.light != NONE)
        add(&sum, glow_along(found, g, light_air_floor[found.light], node_x, node_w, node_pairs), found.E);

    const float albedo = convention == PAPER || extinction == 0.0f ? 0.0f : scattering / extinction;
    const floatw keep = fma(T, (floatw)beta, (floatw)(1.0f - beta)); /* 1 - beta opacity, of which a dense fog leaves few digits */
    const floatw air = fma(keep, albedo, beta) * opacity;
    const floatw fade = keep * half_way;
    STOREW(fma(fade, half_way * LOADW(rgb + i), fma(keep, sum.r, air * color.x)), rgb + i);
    STOREW(fma(fade, half_way * LOADW(rgb + i + plane), fma(keep, sum.g, air * color.y)), rgb + i + plane);
    STOREW(fma(fade, half_way * LOADW(rgb + i + 2 * plane), fma(keep, sum.b, air * color.z)), rgb + i + 2 * plane);
#ifdef LAYERS
    STOREW(T, transmittance + i);
    STOREW(keep * sum.r, in_scatter + i);
    STOREW(keep * sum.g, in_scatter + i + plane);
    STOREW(keep * sum.b, in_scatter + i + 2 * plane);
    STOREW(air * color.x, airlight + i);
    STOREW(air * color.y, airlight + i + plane);
    STOREW(air * color.z, airlight + i + 2 * plane);
#endif
}
