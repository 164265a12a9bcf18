/* brdf.h - Cook-Torrance: GGX, height-correlated Smith, Schlick. Mirrors reference_numpy/brdf.py.
 *
 * The half vector H = l + v is not normalised: with T = H - n (n.H), its part along the surface,
 *     |H|^2 = |T|^2 + (n.H)^2,  den = |T|^2 + alpha^2 (n.H)^2,  LoH = |H| / 2,
 *     D V = alpha^2 |H|^4 / (2 pi den^2 lambda).
 * |T|^2 is what |n x H|^2 is, of which 1 - NoH^2 loses the digits: what rounding does to n.H reaches it squared.
 */
#ifndef BRDF_H
#define BRDF_H
#include "vec.h"

#define MIN_ROUGHNESS 0.045f
#define MIN_NOV 1e-4f
#define DIELECTRIC_F0 0.04f
#define MIN_T2 1e-13f    /* keeps den above 0 where the eye looks along the light; far below alpha^2 */

/* What a surface brings to every light. */
typedef struct {
    floatw nx, ny, nz;   /* normal n, unit */
    floatw tx, ty, tz;   /* part of the view v along the surface, v - n (n.v) */
    floatw nov;          /* n.v, not clamped */
    floatw NoV;          /* clamped */
    floatw a2;           /* alpha^2 */
    floatw root;         /* sqrt(NoV^2 (1 - alpha^2) + alpha^2) */
    floatw grow, rest;   /* NoV^2 (1 - alpha^2), NoV^2 alpha^2 */
} Facing;

static inline Facing facing(
    const floatw nx, const floatw ny, const floatw nz, const floatw vx, const floatw vy, const floatw vz, const floatw roughness)
{
    Facing s;
    s.nx = nx; s.ny = ny; s.nz = nz;
    s.nov = fma(nx, vx, fma(ny, vy, nz * vz));
    s.tx = fma(-s.nov, nx, vx);
    s.ty = fma(-s.nov, ny, vy);
    s.tz = fma(-s.nov, nz, vz);
    s.NoV = clamp(s.nov, MIN_NOV, 1.0f);
    const floatw r = fmax(roughness, MIN_ROUGHNESS);
    s.a2 = r * r * r * r;
    const floatw NoV2 = s.NoV * s.NoV;
    s.grow = fma(-NoV2, s.a2, NoV2);
    s.rest = NoV2 * s.a2;
    s.root = sqrt(s.grow + s.a2);
    return s;
}

/* Share of the light that a dielectric's interface reflects, from above. */
static inline floatw interface_share(const floatw NoV, const floatw roughness)
{
    const floatw t = clamp((roughness - 0.32f) * (1.0f / 0.42f), 0.0f, 1.0f);
    const floatw grazing = 1.04f - (1.04f - 0.122f) * t * t * fma(-2.0f, t, 3.0f);
    const floatw m = 1.0f - NoV, m2 = m * m;
    return fmin(fma(grazing - DIELECTRIC_F0, m2 * m2 * m, DIELECTRIC_F0), 1.0f);
}

/* Light along l = inv p: D V = alpha^2 / (2 pi) |H|^4 / (den^2 lambda), and (1 - LoH)^5 of Schlick's F. */
typedef struct {
    floatw H2, den, lambda, schlick;
} Lobe;

static inline Lobe lobe(
    const Facing s, const floatw px, const floatw py, const floatw pz, const floatw inv, const floatw nop, const floatw NoL)
{
    const floatw tx = fma(fma(-nop, s.nx, px), inv, s.tx);
    const floatw ty = fma(fma(-nop, s.ny, py), inv, s.ty);
    const floatw tz = fma(fma(-nop, s.nz, pz), inv, s.tz);
    const floatw T2 = fma(tx, tx, fma(ty, ty, fma(tz, tz, MIN_T2)));
    const floatw noh = fma(nop, inv, s.nov), noh2 = noh * noh;
    Lobe f;
    f.H2 = T2 + noh2;
    f.den = fma(s.a2, noh2, T2);
    f.lambda = fma(NoL, s.root, sqrt(fma(NoL * NoL, s.grow, s.rest)));
    const floatw m = fma(-0.5f, sqrt(f.H2), 1.0f), m2 = m * m; /* rounding may leave m a trifle below 0 */
    f.schlick = m2 * m2 * m;
    return f;
}
#endif
