/* lamp.h - points and spots that light a stretch of the scene. Mirrors reference_numpy/lamp.py. */
#ifndef LAMP_H
#define LAMP_H
#include "vec.h"

#define DIRECTIONAL 0    /* light_kind; points and spots differ in light_shape alone */
#define EPSILON 1e-4f    /* [m^2] softening of 1/d^2: a lamp's radius of 1 cm, squared */

typedef struct {
    float px, py, pz;    /* position, camera frame [m] */
    float dx, dy, dz;    /* the way the light travels, unit */
    float cos_outer;     /* -1: no cone */
    float sin2_outer;
    float inv_cone;      /* 1 / (cos_inner - cos_outer) */
    float inv_reach;     /* 1 / r_max [1/m] */
} Lamp;

/* light_shape holds cos_outer, its sine squared, 1 / (cos_inner - cos_outer), 1 / r_max */
static inline Lamp lamp(
    const int l, __global const float *restrict light_position, __global const float *restrict light_direction,
    __global const float *restrict light_shape)
{
    Lamp a;
    a.px = light_position[3 * l]; a.py = light_position[3 * l + 1]; a.pz = light_position[3 * l + 2];
    a.dx = light_direction[3 * l]; a.dy = light_direction[3 * l + 1]; a.dz = light_direction[3 * l + 2];
    a.cos_outer = light_shape[4 * l];
    a.sin2_outer = light_shape[4 * l + 1];
    a.inv_cone = light_shape[4 * l + 2];
    a.inv_reach = light_shape[4 * l + 3];
    return a;
}

/* Angular falloff S of t = (cos - cos_outer) / (cos_inner - cos_outer): clamped to [0, 1] before squaring. */
static inline floatw cone(const floatw t)
{
    const floatw c = clamp(t, 0.0f, 1.0f);
    return c * c;
}

/* What rounding took off h = a - b (Knuth's two-sum). */
static inline floatw off_difference(const floatw a, const floatw b, const floatw h)
{
    const floatw c = h - a;
    return (a - (h - c)) - (b + c);
}

/* cos - cos_outer near the cone's edge, where that of a rounded cosine has few digits left. (x, y, z) points from the
 * lamp, (ex, ey, ez) is what rounding took off it; with N along the axis and X across it,
 *     cos - cos_outer = (sin_outer^2 N^2 - cos_outer^2 X^2) / (r (N + r cos_outer)). */
static inline floatw at_cone_edge(
    const Lamp a, const floatw x, const floatw y, const floatw z, const floatw ex, const floatw ey, const floatw ez,
    const floatw inv_r)
{
    const floatw n0 = z * a.dz, n1 = fma(y, a.dy, n0), n = fma(x, a.dx, n1);
    const floatw along = fma(ex, a.dx, fma(ey, a.dy, ez * a.dz));
    const floatw n_lo = fma(z, a.dz, -n0) + fma(y, a.dy, n0 - n1) + fma(x, a.dx, n1 - n) + along;
    const floatw ax = fma(y, a.dz, -z * a.dy), ay = fma(z, a.dx, -x * a.dz), az = fma(x, a.dy, -y * a.dx);
    const floatw X2 = fma(ax, ax, fma(ay, ay, az * az)) + 2.0f * (fma(x, ex, fma(y, ey, z * ez)) - n * along);
    const floatw difference = fma(a.sin2_outer * n, fma(2.0f, n_lo, n), -a.cos_outer * a.cos_outer * X2);
    return difference * inv_r * inv_r / fma(n, inv_r, a.cos_outer);
}

/* Distance window W = (1 - (r / r_max)^4)^2 of t = 1 - (r / r_max)^2: clamped at 0 before squaring. */
static inline floatw window(const floatw t)
{
    const floatw w = fmax(fma(-t, t, 2.0f * t), 0.0f);
    return w * w;
}
#endif
