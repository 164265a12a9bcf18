/* fog.cl - single scattering in a homogeneous medium. Mirrors reference_numpy/fog.py. Paper, supp. "Fog modeling".
 *
 * Two stages: fog_tiles finds the lights that show in the air before a tile's surfaces; fog adds them up.
 *
 * A lane is a pixel, a work-item W pixels of one row. Per light the ray's stretch inside reach and cone is an interval
 * of the scattering angle; Gauss-Legendre nodes lie in pairs a = middle -+ half * x, whose half angles come from one sine
 * and cosine by the addition theorem. With s, c = sin(a/2), cos(a/2) and D the lamp's distance from the ray:
 *     r = D / (2 s c)          lamp to node [m]
 *     x + r = t0 + D s / c     eye to node to lamp [m]
 * neither of which cancels where the ray all but meets the lamp. Where the light shines away from the eye the angle nears
 * pi and float32 loses the difference to it: there `flip` is set and a is the scattering angle's supplement.
 */
#include "include/exp.h"
#include "include/lamp.h"
#include "include/phase.h"
#include "include/tiles.h"
#include "include/trig.h"
#include "include/vec.h"

#define PAPER 1          /* convention */

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

/* What the nodes of one ray and one light have in common. (sm, cm): sine and cosine of half the scattering angle in the
 * stretch's middle. (sl, cl), (sh, ch): of half the angles from the cone's two sides to it, the first times
 * 2 R / (cos_inner - cos_outer), so that cos - cos_outer = 2 R sin(..) sin(..) keeps its digits at the cone's edge. */
typedef struct {
    floatw sm, cm, sl, cl, sh, ch;
    floatw half_D;       /* D / (2 r_max) */
    floatw fade_D;       /* -sigma_t D */
    floatw fade_t0;      /* -sigma_t t0 */
} Stretch;

/* Light from a node but for the phase function; inv is 1 / (s c) of half its scattering angle. No clamp at 0 where rounding
 * alone goes below: S and W are squares. */
static inline floatw node_light(const Stretch a, const bool spot, const floatw sn, const floatw cn, const floatw s, const floatw inv)
{
    const floatw r = a.half_D * inv;    /* of r_max */
    const floatw q = r * r;
    floatw w = fma(-q, q, 1.0f);        /* distance window W is w^2 */
    if (spot)
        w *= fmin(fma(a.sl, cn, a.cl * sn) * fma(a.sh, cn, -a.ch * sn), 1.0f); /* angular falloff S, too */
    return w * w * exp_negative(fma(a.fade_D * (s * s), inv, a.fade_t0));
}

/* The two nodes at -+ (sn, cn) from the middle; one division serves both and their phase functions. */
static inline floatw node_pair(const Stretch a, const bool spot, const floatw sn, const floatw cn, const float g)
{
    const floatw sa = fma(a.sm, cn, -a.cm * sn), ca = fma(a.cm, cn, a.sm * sn);
    const floatw sb = fma(a.sm, cn, a.cm * sn), cb = fma(a.cm, cn, -a.sm * sn);
    const floatw qa = phase_q15(sa, ca, g), qb = phase_q15(sb, cb, g);
    const floatw sca = sa * ca, scb = sb * cb;
    const floatw da = qa * sca, db = qb * scb;
    const floatw inv = 1.0f / (da * db);
    const floatw ia = inv * db, ib = inv * da; /* 1 / da, 1 / db */
    const floatw la = node_light(a, spot, -sn, cn, sa, ia * qa);
    const floatw lb = node_light(a, spot, sn, cn, sb, ib * qb);
    return fma(la, ia * sca, lb * (ib * scb));
}

/* Gauss-Legendre over a stretch whose half angles spread over `spread`: the mean over the stretch, times 2. */
static inline floatw quadrature(
    const Stretch a, const bool spot, const floatw spread, const float g,
    __global const float *restrict node_x, __global const float *restrict node_w, const int node_pairs)
{
    floatw total = 0.0f;
    for (int i = 0; i < node_pairs; i++) {
        floatw cn;
        const floatw sn = sincos_eighth(0.5f * node_x[i] * spread, &cn);
        total = fma(node_w[i], node_pair(a, spot, sn, cn, g), total);
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

/* Single-scattering integral along the rays (x, y, z), equiangular (Kulla and Fajardo 2012). */
static inline floatw along_ray(
    const Lamp lamp, const float r_max, const float air_reach, const Ray ray,
    const floatw x, const floatw y, const floatw z, const floatw s, const float extinction, const float g,
    __global const float *restrict node_x, __global const float *restrict node_w, const int node_pairs)
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
    const float nearest = fmin(r_max, air_reach);
    intw lit = D2 < nearest * nearest;
    intw flip = t0 < 0.0f;
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
        flip = c > 0.0f;
    }
    if (!ANYW(lit))
        return 0.0f;
    const floatw reach = sqrt(fmax(reach2, 0.0f)); /* along the ray, on both sides of its closest approach */
    lit &= (t0 - s < reach) & (t0 > -reach);
    if (!ANYW(lit))
        return 0.0f;

    const floatw inv_D = rsqrt(D2), D = D2 * inv_D;
    const floatw near = fmin(t0, reach), far = fmax(t0 - s, -reach);
    floatw middle = 0.0f, half_cone = 0.0f, gain = 0.0f;
    if (spot) {
        const floatw k = axis_across(lamp, x, y, z, ax, ay, az);
        const floatw root = sqrt(fmax(inside, 0.0f));
        middle = copysign(atan2_quarter(fabs(k), fabs(c) * D), k);
        half_cone = atan2_quarter(root, lamp.cos_outer * D);
        gain = 2.0f * lamp.inv_cone * sqrt(fma(inside * inv_D, inv_D, lamp.cos_outer * lamp.cos_outer));
    }
    /* The angle that the stretch subtends, by the tangent of a difference: a short one would be lost between two angles. */
    const floatw length = SELECTW((near == t0) & (far == t0 - s), s, near - far);
    floatw spread = atan2_upper(D * length, fma(near, far, D2));
    const floatw first = atan2_upper(D, SELECTW(flip, -far, near));
    floatw low = first - middle;
    intw cut = 0; /* whether the stretch begins at the cone's side */
    if (spot) {
        cut = low < -half_cone;
        const floatw high = fmin(low + spread, half_cone);
        const intw clipped = cut | (low + spread > half_cone);
        low = fmax(low, -half_cone);
        spread = SELECTW(clipped, high - low, spread);
    }
    lit &= (spread > 0.0f);
    if (!ANYW(lit))
        return 0.0f;

    /* from here on all angles are halved */
    spread = 0.5f * fmax(spread, 0.0f);
    const floatw centre = fma(0.5f, low, 0.5f * spread);
    Stretch a;
    floatw s_mid, c_mid, cl = 1.0f, ch = 1.0f, sl = 0.0f, sh = 0.0f;
    /* A small angle has no digits to lose on the way over the cone's middle. */
    s_mid = sincos_quarter(SELECTW(cut, fma(0.5f, middle, centre), fma(0.5f, first, 0.5f * spread)), &c_mid);
    if (spot) {
        sl = sincos_quarter(fmax(fma(0.5f, half_cone, centre), 0.0f), &cl);
        sh = sincos_quarter(fmax(fma(0.5f, half_cone, -centre), 0.0f), &ch);
    }
    /* the supplement swaps sine and cosine of the half angle, and the stretch's two ends */
    a.sm = SELECTW(flip, c_mid, s_mid);
    a.cm = SELECTW(flip, s_mid, c_mid);
    a.sl = gain * SELECTW(flip, sh, sl);
    a.cl = gain * SELECTW(flip, ch, cl);
    a.sh = SELECTW(flip, sl, sh);
    a.ch = SELECTW(flip, cl, ch);
    a.half_D = 0.5f * D * lamp.inv_reach;
    a.fade_D = -extinction * D;
    a.fade_t0 = -extinction * t0;
    const floatw total = quadrature(a, spot, spread, g, node_x, node_w, node_pairs);
    const floatw beside = a.half_D * (2.0f * r_max / air_reach);
    return SELECTW(lit, total * spread * inv_D * phase_scale(g) * window(fma(-beside, beside, 1.0f)), 0.0f);
}

/* Whether no ray of the bundle around the unit vector b, of lengths s, meets the ball (centre, radius) that holds a lamp's
 * light: a few scalar operations instead of a vector's. The slack of 1e-3 covers rounding: culling changes no pixel. */
static inline bool misses(const float4 ball, const float3 b, const float half_angle, const floatw s)
{
    const float far2 = dot(ball.xyz, ball.xyz);
    const float t = dot(ball.xyz, b);
    const float slack = (half_angle + 1e-3f) * (sqrt(far2) + ball.w);
    const float miss2 = t > 0.0f ? fma(-t, t, far2) : far2;
    return miss2 > (ball.w + slack) * (ball.w + slack) || !ANYW(s > t - ball.w - slack);
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
    const int height, const int pitch,                  /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,      /* [m] camera frame */
    __global const float *restrict light_air_reach,     /* [m] */
    __global const float *restrict light_ball,          /* [m] centre and radius of what a lamp can light */
    const float sigma_s, const float sigma_a,           /* [1/m] */
    const float alpha,
    const float extent_m,                               /* [m] */
    const int convention)
{
    const float extinction = alpha * (sigma_s + sigma_a);
    const int words = (light_count + 31) / 32;
    __global uint *restrict out = tile_lights + words * (get_global_id(1) * get_global_size(0) + get_global_id(0));
    Frustum tile = frustum(
        depth, sky, extent_m, pitch, height, get_global_id(0) * TILE, get_global_id(1) * TILE, fx, fy, cx, cy);
    tile.near = 0.0f; /* the air before the surfaces is lit, too */
    for (int word = 0; word < words; word++) {
        uint bits = 0;
        for (uint met = meeting(tile, word, light_count, light_ball); met; met &= met - 1) {
            const int l = lowest(word, met);
            const bool placed = light_kind[l] != DIRECTIONAL && convention != PAPER;
            const bool faded = placed && fades_out(vload3(l, light_position), extinction);
            bits |= !faded && light_air_reach[l] > 0.0f ? met & -met : 0u;
        }
        out[word] = bits;
    }
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
    __global const float *restrict light_air_reach,     /* [m] */
    __global const float *restrict light_shape,         /* cos_outer, its sine squared, 1 / (cos_inner - cos_outer), 1 / r_max */
    __global const float *restrict light_ball,          /* [m] centre and radius of what a lamp can light */
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

    const float scattering = alpha * sigma_s;
    const float extinction = alpha * (sigma_s + sigma_a);
    const floatw half_way = exp_negative(-0.5f * extinction * s); /* its square underflows long before what it leaves of 1e5 does */
    const floatw T = half_way * half_way;
    const floatw opacity = one_minus_exp(extinction * s, T);

    const float3 bundle = normalize((float3)((u0 + 0.5f * (W - 1) - cx) / fx, ray.ky, 1.0f));
    const float half_angle = 0.5f * (W - 1) / fx;       /* [rad] at most, off the axis less */
    floatw r = 0.0f, g_ = 0.0f, b = 0.0f;
    for (int word = 0; word < words; word++) {
        for (uint bits = reaching[word]; bits; bits &= bits - 1) {
            const int l = lowest(word, bits), kind = light_kind[l];
            if (kind != DIRECTIONAL && convention != PAPER && misses(vload4(l, light_ball), bundle, half_angle, s))
                continue;
            const float3 E = vload3(l, light_intensity) * (gamma * scattering);
            floatw glow;
            if (kind == DIRECTIONAL) {
                const float3 d = vload3(l, light_direction);
                const floatw mu = -fma(x, d.x, fma(y, d.y, z * d.z));
                glow = henyey_greenstein(mu, g);
                if (convention != PAPER)
                    glow *= extinction > 0.0f ? opacity / extinction : s;
            } else {
                const Lamp a = lamp(l, light_position, light_direction, light_shape);
                glow = convention == PAPER
                    ? at_surface(a, x, y, z, s, g)
                    : along_ray(
                        a, light_r_max[l], light_air_reach[l], ray, x, y, z, s, extinction, g, node_x, node_w, node_pairs);
            }
            r = fma(glow, E.x, r);
            g_ = fma(glow, E.y, g_);
            b = fma(glow, E.z, b);
        }
    }

    const float albedo = convention == PAPER || extinction == 0.0f ? 0.0f : scattering / extinction;
    const floatw keep = fma(T, (floatw)beta, (floatw)(1.0f - beta)); /* 1 - beta opacity, of which a dense fog leaves few digits */
    const floatw air = fma(keep, albedo, beta) * opacity;
    const floatw fade = keep * half_way;
    STOREW(fma(fade, half_way * LOADW(rgb + i), fma(keep, r, air * color.x)), rgb + i);
    STOREW(fma(fade, half_way * LOADW(rgb + i + plane), fma(keep, g_, air * color.y)), rgb + i + plane);
    STOREW(fma(fade, half_way * LOADW(rgb + i + 2 * plane), fma(keep, b, air * color.z)), rgb + i + 2 * plane);
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
