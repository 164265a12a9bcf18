/* ripples.cl - rings of raindrops on puddles. Mirrors reference_numpy/ripples.py.
 * Paper, supp. "Surface Perturbation Effects".
 *
 * A ring's phase runs through many turns: places and distances are hi + lo until the whole turns are taken off.
 */
#include "include/exp.h"
#include "include/noise.h"
#include "include/trig.h"
#include "include/vec.h"
#include "include/world.h"

#define PAPER 1 /* convention */
#define PIXELS 32 /* a cell, as printed */
#define BEAT_BITS 16
#define MOST_SLANT 1e-3f

/* What all rings have in common. */
typedef struct {
    uint tick, mask;
    int life_bits;
    float chance, low, high, wave, steepness;
} Rain;

/* Sums over rings: height times k, and slope along both axes. */
typedef struct {
    floatw height, x, z;
} Surface;

/* sin and cos of quarters of a turn. */
static inline floatw sincos_quarters(const Sharp quarters, floatw *cosine)
{
#pragma OPENCL FP_CONTRACT OFF
    const floatw n = rint(quarters.hi), f = (quarters.hi - n) + quarters.lo;
    const intw turned = INTW(n), odd = (turned & 1) != 0;
    floatw c;
    const floatw s = copysign(sincos_eighth(M_PI_2_F * fabs(f), &c), f);
    const floatw sine = SELECTW(odd, c, s), cosine_ = SELECTW(odd, s, c);
    *cosine = SELECTW(((turned + 1) & 2) != 0, -cosine_, cosine_);
    return SELECTW((turned & 2) != 0, -sine, sine);
}

static inline floatw length_of(const Sharp x, const Sharp z, Sharp *r)
{
#pragma OPENCL FP_CONTRACT OFF
    const Sharp s = sharp_sum(sharp_product(x, x.hi, x.lo), sharp_product(z, z.hi, z.lo));
    r->hi = sqrt(s.hi);
    const floatw inv = 1.0f / fmax(r->hi, 1e-18f);
    r->lo = (fma(-r->hi, r->hi, s.hi) + s.lo) * (0.5f * inv);
    return inv;
}

/* Adds the ring of the latest drop of the cell `cell` to the left and above by (-i, -j), at (u, w) in the own cell. */
static inline void add_ring(
    Surface *sum, const Rain rain, const uintw cell, const float i, const float j, const Sharp u, const Sharp w)
{
    const uintw since = (cell & rain.mask) + rain.tick;
    const uintw place = scramble(cell + (since >> (uint)rain.life_bits) * 0x9E3779B1u), luck = scramble(place);
    const intw fell = unit(luck) < rain.chance;
    if (!ANYW(fell))
        return;
    const floatw age = FLOATW(since & rain.mask) * (1.0f / (float)(1 << rain.life_bits));
    const Sharp back_u = {-(low_half(place) + i), 0.0f}, back_w = {-(high_half(place) + j), 0.0f};
    const Sharp du = sharp_tidy(sharp_sum(u, back_u)), dw = sharp_tidy(sharp_sum(w, back_w));
    Sharp r;
    const floatw inv_r = length_of(du, dw, &r);
    const Sharp away = {-r.hi, -r.lo}, aged = {age, 0.0f}, two = {2.0f, 0.0f};
    const Sharp behind = sharp_sum(aged, away), t = sharp_product(behind, rain.steepness, 0.0f);
    const intw moves = fell & (t.hi > 0.0f) & (t.hi < 2.0f);
    if (!ANYW(moves))
        return;
    const Sharp back_t = {-t.hi, -t.lo}, rest = sharp_sum(two, back_t);
    const floatw q = clamp(fmin(t.hi + t.lo, rest.hi + rest.lo), 0.0f, 1.0f);
    const floatw window = q * q * fma(-2.0f, q, 3.0f);
    const floatw rise = 6.0f * q * (1.0f - q) * (rain.steepness / (rain.wave * M_PI_2_F));
    floatw cosine;
    const floatw sine = sincos_quarters(sharp_product(behind, rain.wave, 0.0f), &cosine);
    const floatw size = unit(scramble(luck)), left = fma(-age, age, 1.0f);
    const floatw strong = SELECTW(moves, fma(rain.high - rain.low, size, rain.low) * left * left, 0.0f);
    const floatw slope = strong * fma(window, cosine, SELECTW(t.hi < 1.0f, rise, -rise) * sine) * inv_r;
    sum->height = fma(-strong * window, sine, sum->height);
    sum->x = fma(slope, du.hi, sum->x);
    sum->z = fma(slope, dw.hi, sum->z);
}

/* All rings that reach a place. */
static inline Surface rings(
    const Rain rain, const intw x, const intw z, const Sharp u, const Sharp w, const int sets, const int seed)
{
    Surface sum = {0.0f, 0.0f, 0.0f};
    for (int n = 0; n < 3 * sets; n++) {
        const int j = n % 3 - 1;
        const uintw row = hash_row(z + j, (uint)(seed + n / 3));
        for (int i = -1; i <= 1; i++)
            add_ring(&sum, rain, hash2(x + i, row), (float)i, (float)j, u, w);
    }
    return sum;
}

/* The printed intensity at a time. */
static inline float beat(const int tick, const float low, const float high)
{
    const float t = fabs((float)(tick & ((1 << BEAT_BITS) - 1)) * (2.0f / (1 << BEAT_BITS)) - 1.0f);
    return fma(high - low, t * t * fma(-2.0f, t, 3.0f), low);
}

/* Squared length of level ground that a pixel sees along the view [m^2]. */
static inline floatw footprint2(
    const floatw kx, const float ky, const floatw z, const float fy, __global const float *restrict up)
{
    const floatw fall = fmax(-fma(kx, up[0], fma((floatw)ky, up[1], up[2])), MOST_SLANT);
    const floatw F = z / (fy * fall);
    return F * F;
}

__kernel void ripples(
    __global const float *restrict puddle,
    __global float *restrict normal,
    __global float *restrict roughness,
    __global const float *restrict depth,               /* [m] */
#ifdef LAYERS
    __global float *restrict ripple,
#endif
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    __global const float *restrict to_world,
    __global const float *restrict to_world_lo,
    __global const float *restrict eye,                 /* [m] from the block's corner */
    __global const float *restrict eye_lo,
    __global const int *restrict block,
    __global const float *restrict up,                  /* unit, camera frame */
    const int tick,
    const int cells,                                    /* a block */
    const int sets,
    const float chance,
    const float low,
    const float high,
    const float wave,                                   /* quarters of a turn a cell */
    const float steepness,
    const int life_bits,
    const float strength,
    const float blur,                                   /* [1/m^2] */
    const float variance,
    const int seed,
    const int convention)
{
    const int u0 = get_global_id(0) * W, v = get_global_id(1);
    const int i = v * pitch + u0, paper = convention == PAPER;
    const floatw M = LOADW(puddle + i);
    if (!ANYW(M > 0.0f)) {
#ifdef LAYERS
        STOREW((floatw)(0.5f), ripple + i);
#endif
        return;
    }
    const floatw du = (float)u0 + LANES - cx;
    const float dv = (float)v - cy;
    const floatw z = LOADW(depth + i);
    Rain rain = {(uint)tick, (1u << life_bits) - 1u, life_bits, chance, low, high, wave, steepness};
    Sharp into_x, into_z;
    intw x, row;
    floatw fine = 0.0f;
    float3 X = {1.0f, 0.0f, 0.0f}, Z = {0.0f, 0.0f, -1.0f}; /* right, and towards the eye */
    if (paper) {
        const floatw at_x = ((float)u0 + LANES) * (1.0f / PIXELS), at_z = (float)v * (1.0f / PIXELS);
        x = INTW(floor(at_x));
        row = INTW(floor(at_z));
        into_x.hi = at_x - floor(at_x);
        into_z.hi = at_z - floor(at_z);
        into_x.lo = into_z.lo = 0.0f;
        rain.low = rain.high = beat(tick, low, high);
    } else {
        const Place at = places(du, dv, z, fx, fy, to_world, to_world_lo, eye, eye_lo);
        x = sharp_cells_of(at.x, block[0], cells, &into_x);
        row = sharp_cells_of(at.z, block[2], cells, &into_z);
        X = vload3(0, to_world);
        Z = vload3(2, to_world);
        fine = blur * footprint2(du / fx, dv / fy, z, fy, up);
    }
    const Surface sum = rings(rain, x, row, into_x, into_z, sets, seed);
#ifdef LAYERS
    STOREW(fma(0.5f * M, sum.height / high, 0.5f), ripple + i);
#endif
    const floatw give = strength * M * exp_negative(-fine), along_x = give * sum.x, along_z = give * sum.z;
    const intw bent = (along_x != 0.0f) | (along_z != 0.0f);
    if (ANYW(bent)) {
        const floatw n0 = LOADW(normal + i), n1 = LOADW(normal + i + plane), n2 = LOADW(normal + i + 2 * plane);
        const floatw nx = n0 - fma(along_x, X.x, along_z * Z.x);
        const floatw ny = n1 - fma(along_x, X.y, along_z * Z.y);
        const floatw nz = n2 - fma(along_x, X.z, along_z * Z.z);
        const floatw was = fma(n0, n0, fma(n1, n1, n2 * n2)), now = fma(nx, nx, fma(ny, ny, nz * nz));
        const floatw keep = sqrt(was / fmax(now, 1e-36f)); /* the length that it had */
        STOREW(SELECTW(bent, nx * keep, n0), normal + i);
        STOREW(SELECTW(bent, ny * keep, n1), normal + i + plane);
        STOREW(SELECTW(bent, nz * keep, n2), normal + i + 2 * plane);
    }
    const floatw lost = one_minus_exp(2.0f * fine, exp_negative(-2.0f * fine)), r = LOADW(roughness + i);
    const floatw added = 2.0f * variance * M * M * lost;
    STOREW(SELECTW(added > 0.0f, fmin(sqrt(sqrt(fma(r * r, r * r, added))), 1.0f), r), roughness + i);
}
