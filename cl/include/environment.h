/* environment.h - octahedral tables, their lookup, lobes of reflection. Mirrors reference_numpy/environment.py. */
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H
#include "gather.h"
#include "srgb.h"
#include "vec.h"

/* Round lobes that stand for the two parts of Schlick's Fresnel term F0 (1 - x) + x: the first three, side by side, for
 * the part with F0, which is long at a slant; the last for the other. */
#define LOBES 4
#define LOBES_F0 3
#define FADING 0.02f

/* Where a bilinear lookup reads: the first of its four texels, and the weights of the right and the lower ones. */
typedef struct {
    intw at;             /* number of the texel */
    int row;             /* texels a row */
    floatw fx, fy;
} Corner;

static inline Corner corner(const floatw x, const floatw y, const int size)
{
    Corner c;
    const intw left = clamp(TOINTW(x), (intw)0, (intw)(size - 2)), top = clamp(TOINTW(y), (intw)0, (intw)(size - 2));
    c.fx = x - FLOATW(left);
    c.fy = y - FLOATW(top);
    c.row = size;
    c.at = top * size + left;
    return c;
}

/* Lookups go from lane to lane: a lane's values lie side by side in the table, and a vector of them takes one load. The
 * texels left and right are mixed last, when the lanes have been turned into vectors of one value each. */
typedef struct {
    float left[4 * W], right[4 * W];
} Sides;

static inline float8 between8(const float8 a, const float8 b, const float f)
{
    return fma((float8)f, b - a, a);
}

/* Two texels side by side, of four floats each, at f between a row and the next. */
static inline float8 between_rows(__global const float *restrict p, const int row, const float f)
{
    return between8(vload8(0, p), vload8(0, p + 4 * row), f);
}

static inline void set_lane(Sides *s, const int lane, const float8 two)
{
    float v[8];
    vstore8(two, 0, v);
    vstore4(vload4(0, v), lane, s->left);
    vstore4(vload4(1, v), lane, s->right);
}

static inline Quad between_sides(const Sides *s, const floatw f)
{
    const Quad a = transposed(s->left), b = transposed(s->right);
    const Quad out = {fma(f, b.x - a.x, a.x), fma(f, b.y - a.y, a.y), fma(f, b.z - a.z, a.z), 0.0f};
    return out;
}

/* Table whose texels are four floats; three of them are used. */
OUT_OF_LINE Quad bilinear(__global const float *restrict table, const Corner c)
{
    int at[W];
    float down[W];
    Sides s;
    STOREW(c.at, at);
    STOREW(c.fy, down);
    for (int j = 0; j < W; j++)
        set_lane(&s, j, between_rows(table + 4 * at[j], c.row, down[j]));
    return between_sides(&s, c.fx);
}

/* Place of a direction of any length but 0 in an octahedral table. */
static inline Corner octahedral(const floatw dx, const floatw dy, const floatw dz, const int size)
{
    const floatw inv = 1.0f / fmax(fabs(dx) + fabs(dy) + fabs(dz), 1e-9f);
    const floatw x = dx * inv, z = dz * inv;
    const intw below = dy < 0.0f;
    const float half_size = 0.5f * (size - 1);
    const floatw u = SELECTW(below, copysign(1.0f - fabs(z), dx), x);
    const floatw v = SELECTW(below, copysign(1.0f - fabs(x), dz), z);
    return corner(fma(u, half_size, (floatw)half_size), fma(v, half_size, (floatw)half_size), size);
}

/* A vector of the camera's frame in the world's, by its rotation. */
static inline void to_world(
    __global const float *restrict R, const floatw x, const floatw y, const floatw z, floatw *X, floatw *Y, floatw *Z)
{
    *X = fma(R[0], x, fma(R[1], y, R[2] * z));
    *Y = fma(R[3], x, fma(R[4], y, R[5] * z));
    *Z = fma(R[6], x, fma(R[7], y, R[8] * z));
}

/* Where the round lobes that stand for the reflection's are found: each is its share, its turn and its roughness. */
static inline Corner lobe_corner(const floatw NoV, const floatw roughness, const int size)
{
    return corner(sqrt(NoV) * (float)(size - 1), roughness * (float)(size - 1), size);
}

/* Prefiltered radiance by roughness. */
OUT_OF_LINE Quad prefiltered(
    __global const float *restrict table, const int levels, const int size,
    const floatw dx, const floatw dy, const floatw dz, const floatw roughness)
{
    const floatw at = roughness * (float)(levels - 1);
    const intw level = clamp(TOINTW(at), (intw)0, (intw)(levels - 2));
    const Corner c = octahedral(dx, dy, dz, size);
    int texel[W];
    float down[W], rougher[W];
    Sides s;
    STOREW(c.at + level * (size * size), texel);
    STOREW(c.fy, down);
    STOREW(at - FLOATW(level), rougher);
    for (int j = 0; j < W; j++) {
        __global const float *p = table + 4 * texel[j];
        const float8 near = between_rows(p, size, down[j]), far = between_rows(p + 4 * size * size, size, down[j]);
        set_lane(&s, j, between8(near, far, rougher[j]));
    }
    return between_sides(&s, c.fx);
}

/* Light from all around, by direction in the world: octahedral tables, or, where it has one colour and is alike all around,
 * cells by elevation. */
typedef struct {
    __global const float *specular, *zonal, *colour;
    int levels, size;            /* of the octahedral table */
    int elevations;              /* cells of a row; 0: the light depends on more */
} Surroundings;

/* Cells at `more` of the way down a row of them, at heights -1 to 1 on the unit sphere, which go from left to right. A cell's
 * corners are left, right, lower left and lower right. */
static inline floatw zonal(
    __global const float *restrict cells, const int elevations, const floatw y, const intw row, const floatw more)
{
    const float half_row = 0.5f * elevations;
    const floatw x = fma(y, half_row, (floatw)half_row);
    const intw left = clamp(TOINTW(x), (intw)0, (intw)(elevations - 1));
    const floatw f = x - FLOATW(left);
    const Quad c = gather(cells, row * elevations + left);
    const floatw upper = fma(f, c.y - c.x, c.x), lower = fma(f, c.w - c.z, c.z);
    return fma(more, lower - upper, upper);
}

/* The same by roughness. */
static inline floatw zonal_light(const Surroundings *s, const floatw y, const floatw roughness)
{
    const floatw at = roughness * (float)(s->levels - 1);
    const intw level = clamp(TOINTW(at), (intw)0, (intw)(s->levels - 2));
    return zonal(s->zonal, s->elevations, y, level, at - FLOATW(level));
}

static inline floatw zonal_irradiance(const Surroundings *s, const floatw y)
{
    return M_PI_F * zonal(s->zonal, s->elevations, y, (intw)(s->levels - 1), 0.0f);
}

static inline Quad coloured(const floatw L, __global const float *restrict colour)
{
    const Quad out = {L * colour[0], L * colour[1], L * colour[2], 0.0f};
    return out;
}

/* Mean radiance of the surroundings around a direction, as wide as the lobe of a roughness. */
OUT_OF_LINE Quad light_around(
    const Surroundings *s, const floatw dx, const floatw dy, const floatw dz, const floatw roughness)
{
    if (s->elevations == 0)
        return prefiltered(s->specular, s->levels, s->size, dx, dy, dz, roughness);
    const floatw y = dy / sqrt(max(fma(dx, dx, fma(dy, dy, dz * dz)), 1e-18f));
    return coloured(zonal_light(s, y, roughness), s->colour);
}

/* The round lobes of a surface: share, turn and roughness of each. */
typedef struct {
    Quad of[LOBES];
} Lobes;

static inline Lobes lobes(__global const float *restrict table, const Corner c)
{
    int at[W];
    float right[W], down[W], found[4 * LOBES * W];
    STOREW(c.at, at);
    STOREW(c.fx, right);
    STOREW(c.fy, down);
    for (int j = 0; j < W; j++) {
        __global const float *p = table + 4 * LOBES * at[j], *q = p + 4 * LOBES * c.row;
        const float16 a = vload16(0, p), b = vload16(1, p), d = vload16(0, q), e = vload16(1, q);
        const float16 left = fma((float16)down[j], d - a, a), other = fma((float16)down[j], e - b, b);
        vstore16(fma((float16)right[j], other - left, left), j, found);
    }
    Lobes out;
    #pragma unroll
    for (int k = 0; k < LOBES; k++) {
        float four[4 * W];
        #pragma unroll
        for (int j = 0; j < W; j++)
            vstore4(vload4(LOBES * j + k, found), j, four);
        out.of[k] = transposed(four);
    }
    return out;
}

/* A surface's mirror direction m and normal n, in the world. */
typedef struct {
    floatw mx, my, mz, nx, ny, nz;
} Mirroring;

/* Light of the round lobes from..to-1 that stand for a part of Schlick's Fresnel term; their share in w. */
static inline Quad reflection(
    const Lobes *lobes, const int from, const int to, const Surroundings *around, const Mirroring *d)
{
    Quad out = {0.0f, 0.0f, 0.0f, 0.0f};
    for (int k = from; k < to; k++) {
        const Quad lobe = lobes->of[k];
        const Quad seen = light_around(
            around, fma(lobe.y, d->nx - d->mx, d->mx), fma(lobe.y, d->ny - d->my, d->my),
            fma(lobe.y, d->nz - d->mz, d->mz), lobe.z);
        out.x = fma(lobe.x, seen.x, out.x);
        out.y = fma(lobe.x, seen.y, out.y);
        out.z = fma(lobe.x, seen.z, out.z);
        out.w += lobe.x;
    }
    return out;
}

/* Light by the two parts of Schlick's Fresnel term, with their shares in w, and irradiance. */
typedef struct {
    Quad A, B, E;
} Received;

/* Where the light goes by elevation, of a direction m + t (n - m) but its height and its length count. */
static inline Received received_by_elevation(const Lobes *lobes, const Surroundings *around, const Mirroring *d)
{
    const floatw m2 = fma(d->mx, d->mx, fma(d->my, d->my, d->mz * d->mz));
    const floatw n2 = fma(d->nx, d->nx, fma(d->ny, d->ny, d->nz * d->nz));
    const floatw mn = fma(d->mx, d->nx, fma(d->my, d->ny, d->mz * d->nz));
    floatw light[LOBES];
    for (int k = 0; k < LOBES; k++) {
        const Quad lobe = lobes->of[k];
        const floatw t = lobe.y, rest = 1.0f - t, size2 = fma(t * t, n2, rest * fma(2.0f * t, mn, rest * m2));
        const floatw y = fma(t, d->ny - d->my, d->my) / sqrt(max(size2, 1e-18f));
        light[k] = lobe.x * zonal_light(around, y, lobe.z);
    }
    Received r;
    r.A = coloured(light[0] + light[1] + light[2], around->colour);
    r.A.w = lobes->of[0].x + lobes->of[1].x + lobes->of[2].x;
    r.B = coloured(light[3], around->colour);
    r.B.w = lobes->of[3].x;
    r.E = coloured(zonal_irradiance(around, d->ny / sqrt(max(n2, 1e-18f))), around->colour);
    return r;
}

static inline Received received(
    const Lobes *lobes, const Surroundings *around, __global const float *restrict irradiance, const Mirroring *d)
{
    if (around->elevations != 0)
        return received_by_elevation(lobes, around, d);
    Received r;
    r.A = reflection(lobes, 0, LOBES_F0, around, d);
    r.B = reflection(lobes, LOBES_F0, LOBES, around, d);
    r.E = bilinear(irradiance, octahedral(d->nx, d->ny, d->nz, around->size));
    return r;
}

/* Share of the specular lobe that is not occluded: Lagarde and de Rousiers 2014 above 0, where theirs ends fading out. */
static inline floatw specular_occlusion(const floatw NoV, const floatw occlusion, const floatw roughness)
{
    const floatw open = exp2_normal(exp2_normal(fma(-16.0f, roughness, -1.0f)) * log2_positive(NoV + occlusion)) - 1.0f + occlusion;
    const floatw root = sqrt(fma(open, open, (floatw)(FADING * FADING)));
    const floatw faded = 0.5f * SELECTW(open > 0.0f, open + root, FADING * FADING / (root - open));
    return fmin(faded, fmin(4.0f * occlusion, 1.0f));
}
#endif
