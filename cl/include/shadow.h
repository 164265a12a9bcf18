/* shadow.h - shadows of the sun, marched through the depth. Mirrors reference_numpy/shadow.py.
 *
 * A sample's place in the picture is carried as a float and what that float leaves out, so that the weights of the four
 * pixels around it are exact to a float's last digits at any distance. That forbids the compiler to fuse a product into
 * a sum: what was left out of the product would be counted twice.
 */
#ifndef SHADOW_H
#define SHADOW_H
#include "gather.h"
#include "vec.h"

#define STEP 0.01171875f
#define BIAS 0.002f
#define SOFT 0.01f
#define FADE 0.25f
#define CLEAR 0.02f
#define NOTHING 1e6f     /* [m] depth of the sky */
#define MAX_SLANT 50.0f
#define SLANTED 4.0f
#define JOINED 0.01f

/* What a float leaves out: a number is hi + lo. */
typedef struct {
    floatw hi, lo;
} Exact;

/* f L - (p - c) M for scalars f, L, c, M, nearly exactly. Two-sums after Knuth 1969, products by fma. */
static inline Exact way_of(const float f, const float L, const floatw p, const float c, const float M)
{
#pragma OPENCL FP_CONTRACT OFF
    const floatw d = p - c, part = d - p;
    const floatw d_lo = (p - (d - part)) - (c + part);
    const floatw q = d * M;
    const floatw q_lo = fma(d, (floatw)M, -q) + d_lo * M;
    const float s = f * L;
    Exact a;
    a.hi = s - q;
    const floatw other = a.hi - s;
    a.lo = (s - (a.hi - other)) - (q + other) + (fma(f, L, -s) - q_lo);
    return a;
}

/* A surface's ray to the sun. */
typedef struct {
    Exact a, b;          /* [px] way in the picture for tau = 1 */
    floatw gu, gv;       /* [1/px] gradient of Z0 / Z on its plane */
    floatw Z0, inv_Z0;
    floatw fade;         /* [m] over which ends what things reach behind what is seen */
} SunRay;

/* Largest whole number not above hi + lo, and what is left, 0 to 1. */
static inline floatw fraction(const floatw hi, const floatw lo, floatw *whole)
{
    const floatw first = floor(hi);
    const floatw rest = (hi - first) + lo, more = floor(rest);
    *whole = first + more;
    return rest - more;
}

/* Share of a ray that a pixel of depth z, off the sample by (du, dv), lets through: z (1 - tau Lz) against Z0, summed
 * so that what nearly cancels does so exactly. Shares that are nearly 0 keep their digits. */
static inline floatw passes(
    const SunRay s, const floatw z, const floatw du, const floatw dv, const float tau_Lz, const float tau_Lz_lo,
    const float inv_c, const floatw inv_fade, const floatw thick)
{
    const floatw slant = tau_Lz_lo - fma(s.gu, du, s.gv * dv);
    const floatw behind = fma(z, slant, fma(z, (floatw)tau_Lz, s.Z0 - z)) * inv_c;
    const floatw before = clamp(fma(-behind, s.inv_Z0, BIAS + SOFT) * (1.0f / SOFT), 0.0f, 1.0f);
    const floatw beyond = clamp((behind - thick) * inv_fade, 0.0f, 1.0f);
    return fma(before, 1.0f - beyond, beyond);
}

/* n.a to a float's last digits even where its terms all but cancel. */
static inline floatw exact_dot(
    const floatw nx, const floatw ny, const floatw nz, const floatw ax, const floatw ay, const floatw az)
{
#pragma OPENCL FP_CONTRACT OFF
    const floatw x = nx * ax, y = ny * ay, z = nz * az;
    const floatw left_out = fma(nx, ax, -x) + fma(ny, ay, -y) + fma(nz, az, -z);
    const floatw xy = x + y, xy_part = xy - x;
    const floatw xyz = xy + z, xyz_part = xyz - xy;
    return xyz + ((x - (xy - xy_part)) + (y - xy_part) + (xy - (xyz - xyz_part)) + (z - xyz_part) + left_out);
}

/* 0 to 1 without a kink at either end. Perlin 2002. */
static inline floatw smooth(const floatw x)
{
    return fmin(x * x * x * fma(x, fma(6.0f, x, (floatw)-15.0f), (floatw)10.0f), 1.0f);
}

/* Share of the sun that arrives. */
static inline floatw sun_shadow(
    __global const float *restrict quads, const intw surface,
    const floatw nx, const floatw ny, const floatw nz, const floatw NoL, const floatw Z0, const floatw u, const float v,
    const int width, const int height, const int pitch,
    const float fx, const float fy, const float cx, const float cy,
    const float3 L, const int steps, const float distance_m, const float thickness_m)
{
#pragma OPENCL FP_CONTRACT OFF
    SunRay s;
    s.a = way_of(fx, L.x, u, cx, L.z);
    s.b = way_of(fy, L.y, (floatw)v, cy, L.z);
    s.Z0 = Z0;
    s.inv_Z0 = 1.0f / Z0;
    const floatw kx = (u - cx) / fx, ky = (floatw)((v - cy) / fy);
    const floatw seen = exact_dot(nx, ny, nz, kx, ky, 1.0f)
        + nx * (fma(-kx, (floatw)fx, u - cx) / fx) + ny * (fma(-ky, (floatw)fy, (floatw)(v - cy)) / fy);
    const floatw slant = fmin(seen, -sqrt(fma(nx, nx, ny * ny)) * (1.0f / MAX_SLANT) - 1e-6f);
    s.gu = nx / (fx * slant);
    s.gv = ny / (fy * slant);
    const floatw steepest = fabs(s.gu) + fabs(s.gv);
    s.fade = fma(Z0, (floatw)SOFT, FADE * thickness_m);
    const intw u_first = TOINTW(u) + 1;
    const int v_first = (int)v + 1; /* of the quads, whose first row and column lie before the picture */

    floatw lit = 1.0f;
    intw alive = surface & (NoL > 0.0f);
    for (int k = 1; k <= steps && ANYW(alive); k++) {
        const float tau = k * STEP;
        const float c = fma(-tau, L.z, 1.0f);
        if (c <= 0.0f)
            break;
        const float inv_c = 1.0f / c;
        const floatw su = tau * s.a.hi, sv = tau * s.b.hi;
        const floatw U = u + su, V = v + sv, t = tau * inv_c * Z0;
        alive &= (U > -1.0f) & (U < (float)width) & (V > -1.0f) & (V < (float)height) & (t < distance_m) & (lit > 0.0f);
        if (!ANYW(alive))
            break;
        floatw fu, fv;
        const floatw wu = fraction(su, fma((floatw)tau, s.a.hi, -su) + tau * s.a.lo, &fu);
        const floatw wv = fraction(sv, fma((floatw)tau, s.b.hi, -sv) + tau * s.b.lo, &fv);
        /* rounding may leave a sample a hair's breadth beyond the border */
        const intw x = clamp(u_first + TOINTW(SELECTW(alive, fu, 0.0f)), (intw)(0), (intw)(width));
        const intw y = clamp(v_first + TOINTW(SELECTW(alive, fv, 0.0f)), (intw)(0), (intw)(height));
        const Quad z = gather(quads, y * (pitch + 1) + x);
        /* Where even the nearest of the four lies behind the ray, whatever its slant, nothing blocks. */
        const floatw nearest = fmin(fmin(z.x, z.y), fmin(z.z, z.w));
        if (!ANYW(alive & (nearest * (c - steepest) < Z0)))
            continue;
        const float tau_Lz = tau * L.z, tau_Lz_lo = fma(tau, L.z, -tau_Lz);
        const floatw across = fmax(fabs(z.y - z.x), fabs(z.w - z.z)), down = fmax(fabs(z.z - z.x), fabs(z.w - z.y));
        const floatw joined = clamp(2.0f - fmax(across, down) / (JOINED * nearest), 0.0f, 1.0f);
        const floatw along = STEP * fma(fabs(s.a.hi), across, fabs(s.b.hi) * down); /* [m] in a step */
        const floatw slanted = joined * fmin(along, SLANTED * thickness_m);
        const floatw fade = fma((floatw)0.5f, slanted, s.fade), inv_fade = 1.0f / fade, thick = thickness_m + slanted;
        const floatw z00 = passes(s, z.x, -wu, -wv, tau_Lz, tau_Lz_lo, inv_c, inv_fade, thick);
        const floatw z10 = passes(s, z.y, 1.0f - wu, -wv, tau_Lz, tau_Lz_lo, inv_c, inv_fade, thick);
        const floatw z01 = passes(s, z.z, -wu, 1.0f - wv, tau_Lz, tau_Lz_lo, inv_c, inv_fade, thick);
        const floatw z11 = passes(s, z.w, 1.0f - wu, 1.0f - wv, tau_Lz, tau_Lz_lo, inv_c, inv_fade, thick);
        const floatw top = fma(wu, z10, (1.0f - wu) * z00), low = fma(wu, z11, (1.0f - wu) * z01);
        const floatw through = fma(wv, low, (1.0f - wv) * top);
        const floatw end = clamp((t - (1.0f - FADE) * distance_m) * (1.0f / (FADE * distance_m)), 0.0f, 1.0f);
        lit = fmin(lit, SELECTW(alive, fma(1.0f - through, end, through), 1.0f));
    }
    const floatw away = smooth(clamp(1.0f - NoL * (1.0f / CLEAR), 0.0f, 1.0f));
    return fma(1.0f - away, smooth(lit), away);
}
#endif
