/* fog.cl - single scattering in a homogeneous medium. Mirrors reference_numpy/fog.py. Paper, supp. "Fog modeling".
 *
 * A lane is a pixel, a work-item W pixels of one row. Per light the ray's stretch inside reach and cone is an interval
 * of the scattering angle; Gauss-Legendre nodes lie in pairs a = middle -+ half * x, whose half angles come from one sine
 * and cosine by the addition theorem. With s, c = sin(a/2), cos(a/2) and D the lamp's distance from the ray:
 *     r = D / (2 s c)          lamp to node [m]
 *     x + r = t0 + D s / c     eye to node to lamp [m]
 * neither of which cancels where the ray all but meets the lamp. Where the light shines away from the eye the angle nears
 * pi and float32 loses the difference to it: there `flip` is set and a is the scattering angle's supplement.
 */
#include "include/phase.h"
#include "include/trig.h"
#include "include/vec.h"

#define DIRECTIONAL 0
#define POINT 1
#define SPOT 2
#define PAPER 1          /* convention */
#define EPSILON 1e-4f    /* [m^2] softening of 1/d^2: a lamp's radius of 1 cm, squared */

typedef struct {
    float px, py, pz;    /* position, camera frame [m] */
    float dx, dy, dz;    /* the way the light travels, unit */
    float cos_outer;     /* -1: no cone */
    float sin2_outer;
    float inv_cone;      /* 1 / (cos_inner - cos_outer) */
    float inv_reach2;    /* 1 / r_max^2 [1/m^2] */
    float reach2;        /* r_max^2 [m^2] */
} Lamp;

/* Angular falloff S of t = (cos - cos_outer) / (cos_inner - cos_outer): clamped to [0, 1] before squaring. */
inline floatw cone(const floatw t)
{
    const floatw c = clamp(t, 0.0f, 1.0f);
    return c * c;
}

/* Distance window W = (1 - (r / r_max)^4)^2 of t = 1 - (r / r_max)^2: clamped at 0 before squaring. */
inline floatw window(const floatw t)
{
    const floatw w = fmax(fma(-t, t, 2.0f * t), 0.0f);
    return w * w;
}

/* The printed in-scatter: phase and attenuated light at the surface at range s. */
inline floatw at_surface(const Lamp lamp, const floatw x, const floatw y, const floatw z, const floatw s, const float g)
{
    const floatw vx = fma(x, s, -lamp.px), vy = fma(y, s, -lamp.py), vz = fma(z, s, -lamp.pz);
    const floatw r2 = fma(vx, vx, fma(vy, vy, fma(vz, vz, EPSILON)));
    const floatw inv = 1.0f / sqrt(r2);
    const floatw mu = -fma(x, vx, fma(y, vy, z * vz)) * inv;
    floatw light = henyey_greenstein(0.5f - 0.5f * mu, 0.5f + 0.5f * mu, g) * window(fmax(fma(-r2, lamp.inv_reach2, 1.0f), 0.0f)) / r2;
    if (lamp.cos_outer >= 0.0f)
        light *= cone((fma(vx, lamp.dx, fma(vy, lamp.dy, vz * lamp.dz)) * inv - lamp.cos_outer) * lamp.inv_cone);
    return light;
}

/* Integrand at the node whose half angle is that of (sm, cm) plus that of (sn, cn); (sl, cl) and (sh, ch) are the half
 * angles from the cone's two sides, so that cos - cos_outer = 2 R sin(..) sin(..) keeps its digits at the cone's edge. */
inline floatw node(
    const Lamp lamp, const floatw D, const floatw reach2, const floatw t0, const intw flip,
    const float extinction, const float g, const floatw gain,
    const floatw sm, const floatw cm, const floatw sl, const floatw cl, const floatw sh, const floatw ch,
    const floatw sn, const floatw cn)
{
    const floatw s = fma(sm, cn, cm * sn), c = fma(cm, cn, -sm * sn);
    const floatw s2 = SELECTW(flip, c * c, s * s), c2 = SELECTW(flip, s * s, c * c); /* of the scattering angle */
    const floatw inv = 1.0f / (s * c);
    const floatw u = 0.5f * D * inv * (c2 - s2); /* along the ray, from its closest approach: r^2 = D^2 + u^2 */
    const floatw t = fmax(fma(-u, u, reach2), 0.0f) * lamp.inv_reach2;
    floatw light = henyey_greenstein(s2, c2, g) * window(t) * exp(-extinction * fma(D * s2, inv, t0));
    if (lamp.cos_outer >= 0.0f)
        light *= cone(gain * fma(sl, cn, cl * sn) * fma(sh, cn, -ch * sn));
    return light;
}

/* Single-scattering integral along the rays (x, y, z), equiangular (Kulla and Fajardo 2012). */
inline floatw along_ray(
    const Lamp lamp, const floatw x, const floatw y, const floatw z, const floatw s,
    const float extinction, const float g,
    __global const float *restrict node_x, __global const float *restrict node_w, const int node_pairs)
{
    const floatw t0 = fma(x, lamp.px, fma(y, lamp.py, z * lamp.pz));
    /* across = position x ray: the distance from it loses no digits where |position| >> D */
    const floatw ax = lamp.py * z - lamp.pz * y;
    const floatw ay = lamp.pz * x - lamp.px * z;
    const floatw az = lamp.px * y - lamp.py * x;
    const floatw D2 = fma(ax, ax, fma(ay, ay, fma(az, az, EPSILON)));
    const floatw reach2 = lamp.reach2 - D2;
    const floatw reach = sqrt(fmax(reach2, 0.0f)); /* along the ray, on both sides of its closest approach */
    intw lit = (reach2 > 0.0f) & (t0 - s < reach) & (t0 > -reach);
    if (!ANYW(lit))
        return 0.0f;

    const floatw D = sqrt(D2);
    const floatw near = fmin(t0, reach), far = fmax(t0 - s, -reach);
    intw flip = t0 < 0.0f;
    floatw middle = 0.0f, half_cone = 0.0f, gain = 0.0f;
    if (lamp.cos_outer >= 0.0f) {
        /* The cosine to the spot's axis at angle a is k sin(a) + |c| cos(a) = R cos(a - middle), and the ray meets the cone
         * where inside = R^2 - cos_outer^2 > 0. A narrow cone's R^2 is near 1: there R^2 = 1 - m^2, with m the axis'
         * component along `across`, keeps the digits that decide a grazing ray. */
        const floatw c = fma(x, lamp.dx, fma(y, lamp.dy, z * lamp.dz));
        const floatw k = -((y * az - z * ay) * lamp.dx + (z * ax - x * az) * lamp.dy + (x * ay - y * ax) * lamp.dz) / D;
        const floatw R2 = fma(c, c, k * k);
        floatw inside = R2 - lamp.cos_outer * lamp.cos_outer;
        if (lamp.cos_outer > M_SQRT1_2_F) {
            const floatw m = fma(ax, lamp.dx, fma(ay, lamp.dy, az * lamp.dz)) / D;
            inside = fma(-m, m, lamp.sin2_outer) - EPSILON / D2 * (1.0f - c * c);
        }
        lit &= (inside > 0.0f);
        if (!ANYW(lit))
            return 0.0f;
        flip = c > 0.0f;
        middle = copysign(atan2_upper(fabs(k), fabs(c)), k);
        half_cone = atan2_upper(sqrt(fmax(inside, 0.0f)), (floatw)(lamp.cos_outer));
        gain = 2.0f * lamp.inv_cone * sqrt(R2);
    }
    /* The angle that the stretch subtends, by the tangent of a difference: a short one would be lost between two angles. */
    const floatw length = SELECTW((near == t0) & (far == t0 - s), s, near - far);
    floatw spread = atan2_upper(D * length, fma(near, far, D2));
    floatw low = atan2_upper(D, SELECTW(flip, -far, near)) - middle;
    if (lamp.cos_outer >= 0.0f) {
        const floatw high = fmin(low + spread, half_cone);
        const intw clipped = (low < -half_cone) | (low + spread > half_cone);
        low = fmax(low, -half_cone);
        spread = SELECTW(clipped, high - low, spread);
    }
    lit &= (spread > 0.0f);
    if (!ANYW(lit))
        return 0.0f;

    /* from here on all angles are halved */
    spread = 0.5f * fmax(spread, 0.0f);
    const floatw centre = fma(0.5f, low, 0.5f * spread);
    floatw cm, cl = 1.0f, ch = 1.0f, sl = 0.0f, sh = 0.0f, total = 0.0f;
    const floatw sm = sincos_quarter(fma(0.5f, middle, centre), &cm);
    if (lamp.cos_outer >= 0.0f) {
        sl = sincos_quarter(fmax(fma(0.5f, half_cone, centre), 0.0f), &cl);
        sh = sincos_quarter(fmax(fma(0.5f, half_cone, -centre), 0.0f), &ch);
    }
    for (int i = 0; i < node_pairs; i++) {
        floatw cn;
        const floatw sn = sincos_eighth(0.5f * node_x[i] * spread, &cn);
        total = fma(node_w[i], node(lamp, D, reach2, t0, flip, extinction, g, gain, sm, cm, sl, cl, sh, ch, -sn, cn)
                             + node(lamp, D, reach2, t0, flip, extinction, g, gain, sm, cm, sl, cl, sh, ch, sn, cn), total);
    }
    return SELECTW(lit, total * spread / D, 0.0f);
}

__kernel void fog(
    __global float *restrict rgb,                       /* scene-linear; edited in place */
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
#ifdef LAYERS
    __global float *restrict transmittance,
    __global float *restrict in_scatter,
    __global float *restrict airlight,
#endif
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,      /* [m] camera frame */
    __global const float *restrict light_direction,
    __global const float *restrict light_intensity,
    __global const float *restrict light_cos_inner,
    __global const float *restrict light_cos_outer,
    __global const float *restrict light_r_max,         /* [m] */
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

    const floatw kx = ((float)u0 + LANES - cx) / fx;
    const float ky = ((float)v - cy) / fy;
    const floatw stretch = sqrt(fma(kx, kx, fma(ky, ky, 1.0f)));
    const floatw z = 1.0f / stretch;
    const floatw x = kx * z, y = ky * z;

    floatw s = fmin(LOADW(depth + i) * stretch, extent_m);
    if (convention != PAPER)
        s = SELECTW(LOADMASKW(sky + i), extent_m, s);

    const float scattering = alpha * sigma_s;
    const float extinction = alpha * (sigma_s + sigma_a);
    const floatw T = exp(-extinction * s);
    const floatw opacity = -expm1(-extinction * s);

    floatw r = 0.0f, g_ = 0.0f, b = 0.0f;
    for (int l = 0; l < light_count; l++) {
        const int kind = light_kind[l];
        const float3 E = vload3(l, light_intensity) * (gamma * scattering);
        const float3 p = vload3(l, light_position), d = vload3(l, light_direction);
        floatw glow;
        if (kind == DIRECTIONAL) {
            const floatw mu = -fma(x, d.x, fma(y, d.y, z * d.z));
            glow = henyey_greenstein(0.5f - 0.5f * mu, 0.5f + 0.5f * mu, g);
            if (convention != PAPER)
                glow *= extinction > 0.0f ? opacity / extinction : s;
        } else {
            Lamp lamp;
            lamp.px = p.x; lamp.py = p.y; lamp.pz = p.z;
            lamp.dx = d.x; lamp.dy = d.y; lamp.dz = d.z;
            lamp.cos_outer = kind == SPOT ? light_cos_outer[l] : -1.0f;
            lamp.sin2_outer = (1.0f - lamp.cos_outer) * (1.0f + lamp.cos_outer);
            lamp.inv_cone = 1.0f / (light_cos_inner[l] - light_cos_outer[l]);
            lamp.reach2 = light_r_max[l] * light_r_max[l];
            lamp.inv_reach2 = 1.0f / lamp.reach2;
            glow = convention == PAPER ? at_surface(lamp, x, y, z, s, g)
                                       : along_ray(lamp, x, y, z, s, extinction, g, node_x, node_w, node_pairs);
        }
        r = fma(glow, E.x, r);
        g_ = fma(glow, E.y, g_);
        b = fma(glow, E.z, b);
    }

    const float albedo = convention == PAPER || extinction == 0.0f ? 0.0f : scattering / extinction;
    const floatw keep = fma(-beta, opacity, 1.0f);
    const floatw air = fma(keep, albedo, beta) * opacity;
    const floatw fade = keep * T;
    STOREW(fma(fade, LOADW(rgb + i), fma(keep, r, air * color.x)), rgb + i);
    STOREW(fma(fade, LOADW(rgb + i + plane), fma(keep, g_, air * color.y)), rgb + i + plane);
    STOREW(fma(fade, LOADW(rgb + i + 2 * plane), fma(keep, b, air * color.z)), rgb + i + 2 * plane);
#ifdef LAYERS
    STOREW(T, transmittance + i);
    STOREW(keep * r, in_scatter + i);
    STOREW(keep * g_, in_scatter + i + plane);
    STOREW(keep * b, in_scatter + i + 2 * plane);
    STOREW(air * color.x, airlight + i);
    STOREW(air * color.y, airlight + i + plane);
    STOREW(air * color.z, airlight + i + 2 * plane);
#endif
}
