/* particle_light.h - what lights particles. Mirrors reference_numpy/particle_light.py. */
#ifndef PARTICLE_LIGHT_H
#define PARTICLE_LIGHT_H
#include "environment.h"
#include "exp.h"
#include "lamp.h"
#include "phase.h"
#include "vec.h"

/* The light that meets particles. */
typedef struct {
    int count;
    __global const int *kind;
    __global const float *position, *direction, *intensity, *shape;
    __global const float *rotation, *specular;
    int levels, size;
    __global const float *sun_direction, *sun_irradiance;
    float lobe, g;
    float haze;
    __global const float *haze_color;
} Light;

typedef struct {
    floatw x, y, z;
} Triple;

/* Phase function of light that comes from the direction l and goes on to the eye against the ray v, both unit. */
static inline floatw turned(const Triple v, const floatw lx, const floatw ly, const floatw lz, const float g)
{
    const floatw ax = v.x - lx, ay = v.y - ly, az = v.z - lz;
    const floatw bx = v.x + lx, by = v.y + ly, bz = v.z + lz;
    const floatw s = 0.5f * sqrt(fma(ax, ax, fma(ay, ay, az * az)));
    const floatw c = 0.5f * sqrt(fma(bx, bx, fma(by, by, bz * bz)));
    return phase_scale(g) / phase_q15(s, c, g);
}

/* What of a lamp's intensity reaches the eye by particles at (x, y, z), seen along v. */
static inline floatw by_lamp(const Light by, const int l, const floatw x, const floatw y, const floatw z, const Triple v)
{
    __global const float *d = by.direction + 3 * l, *p = by.position + 3 * l, *shape = by.shape + 4 * l;
    if (by.kind[l] == DIRECTIONAL)
        return turned(v, (floatw)(-d[0]), (floatw)(-d[1]), (floatw)(-d[2]), by.g);
    const floatw px = p[0] - x, py = p[1] - y, pz = p[2] - z;
    const floatw d2 = fma(px, px, fma(py, py, pz * pz));
    floatw light = window(1.0f - d2 * (shape[3] * shape[3]));
    if (!ANYW(light > 0.0f))
        return 0.0f;
    const floatw inv = 1.0f / sqrt(fmax(d2, 1e-18f));
    const floatw lx = px * inv, ly = py * inv, lz = pz * inv;
    if (shape[0] >= 0.0f)
        light *= cone((-fma(lx, d[0], fma(ly, d[1], lz * d[2])) - shape[0]) * shape[2]);
    return light / (d2 + EPSILON) * turned(v, lx, ly, lz, by.g);
}

/* Radiance of particles at (x, y, z), through the haze. */
static inline Triple particle_color(const Light by, const floatw x, const floatw y, const floatw z)
{
    const floatw distance = sqrt(fma(x, x, fma(y, y, z * z))), inv = 1.0f / fmax(distance, 1e-9f);
    const Triple v = {x * inv, y * inv, z * inv};
    floatw X, Y, Z;
    to_world(by.rotation, v.x, v.y, v.z, &X, &Y, &Z);
    const Quad around = prefiltered(by.specular, by.levels, by.size, X, Y, Z, (floatw)(by.lobe));
    __global const float *s = by.sun_direction;
    const floatw sun = turned(v, (floatw)(s[0]), (floatw)(s[1]), (floatw)(s[2]), by.g);
    Triple c;
    c.x = fma(sun, by.sun_irradiance[0], around.x);
    c.y = fma(sun, by.sun_irradiance[1], around.y);
    c.z = fma(sun, by.sun_irradiance[2], around.z);
    for (int l = 0; l < by.count; l++) {
        const floatw falls = by_lamp(by, l, x, y, z, v);
        __global const float *intensity = by.intensity + 3 * l;
        c.x = fma(falls, intensity[0], c.x);
        c.y = fma(falls, intensity[1], c.y);
        c.z = fma(falls, intensity[2], c.z);
    }
    const floatw tau = by.haze * distance, T = exp_negative(-tau), haze = one_minus_exp(tau, T);
    c.x = fma(T, c.x, haze * by.haze_color[0]);
    c.y = fma(T, c.y, haze * by.haze_color[1]);
    c.z = fma(T, c.z, haze * by.haze_color[2]);
    return c;
}

#endif
