/* environment.h - octahedral tables, their lookup, lobes of reflection. Mirrors reference_numpy/environment.py. */
#ifndef ENVIRONMENT_H
#define ENVIRONMENT_H
#include "gather.h"
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
    const floatw left = clamp(floor(x), 0.0f, (float)(size - 2));
    const floatw top = clamp(floor(y), 0.0f, (float)(size - 2));
    c.fx = x - left;
    c.fy = y - top;
    c.row = size;
    c.at = TOINTW(top) * size + TOINTW(left);
    return c;
}

static inline floatw between(const floatw a, const floatw b, const floatw p, const floatw q, const Corner c)
{
    const floatw top = fma(c.fx, b - a, a), low = fma(c.fx, q - p, p);
    return fma(c.fy, low - top, top);
}

/* Texel `skip` of every `stride` of a table whose texels are four floats; three of them are used. */
static inline Quad bilinear(__global const float *restrict table, const Corner c, const int stride, const int skip)
{
    const intw i = c.at * stride + skip;
    const Quad a = gather(table, i), b = gather(table, i + stride);
    const Quad p = gather(table, i + c.row * stride), q = gather(table, i + (c.row + 1) * stride);
    Quad out;
    out.x = between(a.x, b.x, p.x, q.x, c);
    out.y = between(a.y, b.y, p.y, q.y, c);
    out.z = between(a.z, b.z, p.z, q.z, c);
    return out;
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
static inline Quad prefiltered(
    __global const float *restrict table, const int levels, const int size,
    const floatw dx, const floatw dy, const floatw dz, const floatw roughness)
{
    const floatw at = roughness * (float)(levels - 1);
    const floatw level = clamp(floor(at), 0.0f, (float)(levels - 2));
    const floatw f = at - level;
    Corner c = octahedral(dx, dy, dz, size);
    c.at += TOINTW(level) * (size * size);
    const Quad near = bilinear(table, c, 1, 0);
    c.at += size * size;
    const Quad far = bilinear(table, c, 1, 0);
    Quad out;
    out.x = fma(f, far.x - near.x, near.x);
    out.y = fma(f, far.y - near.y, near.y);
    out.z = fma(f, far.z - near.z, near.z);
    return out;
}

/* Light of the round lobes from..to-1 that stand for a part of Schlick's Fresnel term, by the mirror direction X, Y, Z and
 * the normal in the world; their share in w. */
static inline Quad reflection(
    __global const float *restrict table, const Corner at, const int from, const int to,
    __global const float *restrict specular, const int levels, const int size,
    const floatw X, const floatw Y, const floatw Z, const floatw Nx, const floatw Ny, const floatw Nz)
{
    Quad out = {0.0f, 0.0f, 0.0f, 0.0f};
    for (int k = from; k < to; k++) {
        const Quad lobe = bilinear(table, at, LOBES, k);
        const Quad seen = prefiltered(
            specular, levels, size, fma(lobe.y, Nx - X, X), fma(lobe.y, Ny - Y, Y), fma(lobe.y, Nz - Z, Z), lobe.z);
        out.x = fma(lobe.x, seen.x, out.x);
        out.y = fma(lobe.x, seen.y, out.y);
        out.z = fma(lobe.x, seen.z, out.z);
        out.w += lobe.x;
    }
    return out;
}

/* Share of the specular lobe that is not occluded: Lagarde and de Rousiers 2014 above 0, where theirs ends fading out. */
static inline floatw specular_occlusion(const floatw NoV, const floatw occlusion, const floatw roughness)
{
    const floatw open = exp2(exp2(fma(-16.0f, roughness, -1.0f)) * log2(NoV + occlusion)) - 1.0f + occlusion;
    const floatw root = sqrt(fma(open, open, (floatw)(FADING * FADING)));
    const floatw faded = 0.5f * SELECTW(open > 0.0f, open + root, FADING * FADING / (root - open));
    return fmin(faded, fmin(4.0f * occlusion, 1.0f));
}
#endif
