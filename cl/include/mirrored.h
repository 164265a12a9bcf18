/* mirrored.h - mirrored rays and their way in the picture. Mirrors reference_numpy/mirrored.py.
 *
 * How high a thing lies above a ray is a small difference of large numbers, and decides what a sharp mirror shows. So all
 * that is multiplied by rows and columns is split into what sums up without rounding, and the rest.
 */
#ifndef MIRRORED_H
#define MIRRORED_H
#include "brdf.h"
#include "ramps.h"
#include "sharp.h"

#define LOBE 2.0f
#define NEAR 0.005f
#define MIN_COSINE 0.05f
#define MIN_AHEAD 0.1f
#define MIN_RISE 0.25f
#define MOST_COLUMNS 8192.0f

/* Height [m] of what lies at depth z, columns and rows off the mirroring pixel: z (at + columns by_u - rows by_v) - own. */
typedef struct {
    Sharp at, by_u, by_v, own;
} Height;

typedef struct {
    intw on;                     /* which are wanted */
    floatw u, Z0, inv_near;      /* [px], [m], [1/m] */
    Height above;                /* a thing above the mirrored ray, in the plane of incidence */
    Height over;                 /* above the mirroring place */
    Sharp lean;                  /* [px] to the right, a row down */
    floatw inv_Lz, lobe;         /* depth to way along the ray; [rad] half the lobe's width */
    floatw below, inv_above;     /* share of the lobe below the level, and 1 over that above it */
    floatw fit;                  /* 0 where no one line of the picture shows the lobe, 1 where it does */
    floatw NoV;
} Mirrored;

/* Inverse of a number, and what rounding it leaves out. */
static inline Sharp inverse(const float f)
{
#pragma OPENCL FP_CONTRACT OFF
    const float inv = 1.0f / f;
    const Sharp s = {inv, fma(-inv, f, 1.0f) * inv};
    return s;
}

/* The same number, up to half of the bound, a power of two; hi a multiple of bound / 2^23. Whole multiples of it, and sums
 * of them, are exact up to twice the bound. */
static inline Sharp split(const Sharp a, const float bound)
{
#pragma OPENCL FP_CONTRACT OFF
    Sharp s;
    s.hi = (a.hi + 1.5f * bound) - 1.5f * bound;
    s.lo = (a.hi - s.hi) + a.lo;
    return s;
}

static inline Height height_of(const Sharp at, const Sharp by_u, const Sharp by_v, const floatw Z0, const float bound)
{
    Height h;
    h.at = split(at, bound);
    h.by_u = split(by_u, bound);
    h.by_v = split(by_v, bound);
    h.own = sharp_product(at, Z0, 0.0f);
    return h;
}

/* Height by metre of depth in a column and row of the picture. */
static inline Sharp slope(const Height *h, const floatw columns, const float rows)
{
    Sharp s;
    s.hi = fma(columns, h->by_u.hi, fma((floatw)-rows, h->by_v.hi, h->at.hi));
    s.lo = fma(columns, h->by_u.lo, fma((floatw)-rows, h->by_v.lo, h->at.lo));
    return s;
}

/* A column on. */
static inline Sharp next_slope(const Height *h, const Sharp a)
{
    const Sharp s = {a.hi + h->by_u.hi, a.lo + h->by_u.lo};
    return s;
}

static inline floatw height(const Height *h, const Sharp slope, const floatw z)
{
    return fma(z, slope.hi, -h->own.hi) + fma(z, slope.lo, -h->own.lo);
}

/* A power of two, more than twice as long as the ray of any pixel, a column more than the picture has. */
static inline float bound_of_rays(
    const int width, const int height, const float fx, const float fy, const float cx, const float cy)
{
    const float x = fmax(fabs(cx), fabs(width - cx)) / fx, y = fmax(fabs(cy), fabs(height - cy)) / fy;
    return 4.0f * as_float(as_uint(1.0f + x + y) & 0x7f800000u);
}

/* Rays of the line of sight (kx, ky, 1), mirrored at normals that need not be of length 1. `up` is the world's. */
static inline Mirrored mirrored(
    const floatw nx, const floatw ny, const floatw nz, const floatw Z0, const floatw u, const float v,
    const floatw roughness, const float fx, const float fy, const float cx, const float cy, const float3 up, const float bound)
{
#pragma OPENCL FP_CONTRACT OFF
    Mirrored m;
    m.u = u;
    m.Z0 = Z0;
    m.inv_near = 1.0f / (NEAR * Z0);
    const Sharp du = sharp_sum(sharp(u), sharp(-cx)), dv = sharp_sum(sharp(v), sharp(-cy));
    const Sharp by_fx = inverse(fx), by_fy = inverse(fy);
    const Sharp kx = sharp_product(du, by_fx.hi, by_fx.lo), ky = sharp_product(dv, by_fy.hi, by_fy.lo);
    const Sharp rr = sharp_sum(
        sharp_sum(sharp_product(kx, kx.hi, kx.lo), sharp_product(ky, ky.hi, ky.lo)), sharp(1.0f));
    const Sharp S = sharp_sum(sharp_sum(sharp_product(kx, nx, 0.0f), sharp_product(ky, ny, 0.0f)), sharp(nz));
    const Sharp nn = sharp_sum(
        sharp_sum(sharp_product(sharp(nx), nx, 0.0f), sharp_product(sharp(ny), ny, 0.0f)),
        sharp_product(sharp(nz), nz, 0.0f));
    const Sharp over = sharp_quotient(sharp_product(S, S.hi, S.lo), nn), minus = {-over.hi, -over.lo};
    const Sharp rest = sharp_sum(rr, minus), along = sharp_sum(rest, minus);
    const floatw inv_n = 1.0f / sqrt(nn.hi), inv_r = 1.0f / sqrt(rr.hi);
    m.NoV = clamp(-S.hi * inv_n * inv_r, MIN_NOV, 1.0f); /* sine of the angle between surface and ray */
    const floatw cosine = fmax(sqrt(fmax(rest.hi, 0.0f)) * inv_r, MIN_COSINE);

    /* Square to the ray, upwards: p = unit (along n + S r). What lies q above the ray, in its and n's plane, has p.X - p.P = q,
     * X and P being it and the mirroring place. */
    const floatw unit = inv_n * inv_r * inv_r / cosine;
    const Sharp px = sharp_sum(sharp_product(along, nx, 0.0f), sharp_product(S, kx.hi, kx.lo));
    const Sharp py = sharp_sum(sharp_product(along, ny, 0.0f), sharp_product(S, ky.hi, ky.lo));
    const Sharp pr = sharp_product(S, rest.hi, rest.lo);
    m.above = height_of(
        sharp_product(pr, 2.0f * unit, 0.0f),
        sharp_product(sharp_product(px, by_fx.hi, by_fx.lo), unit, 0.0f),
        sharp_product(sharp_product(py, by_fy.hi, by_fy.lo), unit, 0.0f), Z0, bound);
    const Sharp up_r = sharp_sum(sharp_sum(sharp_product(kx, up.x, 0.0f), sharp_product(ky, up.y, 0.0f)), sharp(up.z));
    m.over = height_of(up_r, sharp_product(by_fx, up.x, 0.0f), sharp_product(by_fy, up.y, 0.0f), Z0, bound);

    const Sharp across = sharp_sum(sharp_product(sharp(nx), fx, 0.0f), sharp_product(du, -nz, 0.0f));
    const Sharp down = sharp_sum(sharp_product(sharp(ny), fy, 0.0f), sharp_product(dv, -nz, 0.0f));
    const floatw rise = -down.hi * inv_n / fy, Lz = fma(2.0f * m.NoV * inv_n, nz, inv_r);
    const intw steep = rise >= MIN_RISE;
    const Sharp safe = {SELECTW(steep, down.hi, -1.0f), SELECTW(steep, down.lo, 0.0f)};
    const Sharp lean = sharp_quotient(across, safe);
    const floatw upwards = (1.0f - fabs(lean.hi)) - SELECTW(lean.hi < 0.0f, -lean.lo, lean.lo); /* 1 - |lean| */
    m.fit = SELECTW(steep, smooth_ramp(rise * (1.0f / MIN_RISE) - 1.0f) * smooth_ramp(2.0f * upwards)
        * smooth_ramp(Lz * (1.0f / MIN_AHEAD) - 1.0f), 0.0f);
    const intw none = !(m.fit > 0.0f); /* lean may be anything */
    const Sharp upright = {SELECTW(none, 0.0f, lean.hi), SELECTW(none, 0.0f, lean.lo)};
    m.lean = split(upright, MOST_COLUMNS);
    m.inv_Lz = 1.0f / fmax(Lz, MIN_AHEAD);
    m.lobe = LOBE * roughness * roughness;
    m.below = smooth_ramp(0.5f - 0.5f * m.NoV / (cosine * fmax(m.lobe, 1e-6f)));
    m.inv_above = (1.0f + 0x1p-23f) / (1.0f - m.below); /* never less than it is: the whole share above is 1 or more */
    return m;
}
#endif
