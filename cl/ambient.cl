/* ambient.cl - light of the surroundings on the surfaces. Mirrors reference_numpy/ambient.py. Paper, "Environment".
 *
 * Three stages: ambient_solid takes the sky out of the depth; ambient_quads puts the depths of every four neighbouring
 * pixels side by side, so that a sample of a shadow ray is one load; ambient does the rest.
 */
#include "include/brdf.h"
#include "include/environment.h"
#include "include/occlusion.h"
#include "include/shadow.h"
#include "include/vec.h"

__kernel void ambient_solid(
    __global float *restrict ambient_depth,
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
    const int pitch)                                    /* [px] row length, a multiple of W */
{
    const int i = get_global_id(1) * pitch + get_global_id(0) * W;
    STOREW(SELECTW(LOADMASKW(sky + i), NOTHING, fmin(LOADW(depth + i), NOTHING)), ambient_depth + i);
}

static inline float solid_or_nothing(
    __global const float *restrict solid, const int x, const int y, const int width, const int height, const int pitch)
{
    return x >= 0 && x < width && y >= 0 && y < height ? solid[y * pitch + x] : NOTHING;
}

/* Quads of part of a row, told by their upper left pixels. */
static inline void write_quads(
    __global float *restrict quads, __global const float *restrict solid, const int from, const int to, const int y,
    const int width, const int height, const int pitch)
{
    for (int x = from; x < to; x++) {
        float4 q;
        q.x = solid_or_nothing(solid, x, y, width, height, pitch);
        q.y = solid_or_nothing(solid, x + 1, y, width, height, pitch);
        q.z = solid_or_nothing(solid, x, y + 1, width, height, pitch);
        q.w = solid_or_nothing(solid, x + 1, y + 1, width, height, pitch);
        vstore4(q, (y + 1) * (pitch + 1) + x + 1, quads);
    }
}

__kernel void ambient_quads(
    __global float *restrict ambient_quad,
    __global const float *restrict ambient_depth,
    const int width, const int height,                  /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int sun_on)
{
    if (!sun_on)
        return;
    const int u0 = get_global_id(0) * W, v = get_global_id(1);
    const int from = u0 == 0 ? -1 : u0;
    write_quads(ambient_quad, ambient_depth, from, u0 + W, v, width, height, pitch);
    if (v == 0)
        write_quads(ambient_quad, ambient_depth, from, u0 + W, -1, width, height, pitch);
}

/* Share of white surroundings' light that leaves the microfacets after more than one reflection. Fdez-Aguera 2019. */
static inline floatw reflected_again(const floatw F0, const floatw A, const floatw B)
{
    const floatw mean = fma(F0, 20.0f / 21, 1.0f / 21), more = mean * (1.0f - (A + B));
    return fma(F0, A, B) * more / (1.0f - more);
}

__kernel void ambient(
    __global float *restrict rgb,                       /* scene-linear */
    __global float *restrict occlusion,
    __global const float *restrict ambient_depth,       /* [m] NOTHING in the sky */
    __global const float *restrict ambient_quad,
    __global const float *restrict normal,
    __global const float *restrict albedo,
    __global const float *restrict roughness,
    __global const float *restrict metallic,
#ifdef LAYERS
    __global float *restrict ambient,
    __global float *restrict shadow,
#endif
    const int width, const int height,                  /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    __global const float *restrict env_rotation,        /* camera to world */
    __global const float *restrict env_irradiance,
    __global const float *restrict env_specular,
    __global const float *restrict env_brdf,
    __global const float *restrict env_backdrop,
    __global const float *restrict env_zonal,
    __global const float *restrict env_colour,
    const int env_levels, const int env_size, const int env_brdf_size, const int env_backdrop_size, const int env_elevations,
    __global const float *restrict sun_direction,       /* towards the sun, camera frame */
    __global const float *restrict sun_irradiance,
    const int sun_on,
    const int shadow_steps,
    const float shadow_distance_m,                      /* [m] */
    const float thickness_m,                            /* [m] */
    const float occlusion_radius_m,                     /* [m] */
    const int occlusion_slices,
    const int occlusion_steps)
{
    const int u0 = get_global_id(0) * W;
    const int v = get_global_id(1);
    const int i = v * pitch + u0;
    const floatw u = (float)u0 + LANES;
    const floatw kx = (u - cx) / fx;
    const float ky = ((float)v - cy) / fy;
    const floatw inv = rsqrt(fma(kx, kx, fma(ky, ky, 1.0f)));
    const floatw z = LOADW(ambient_depth + i);
    const intw surface = z < NOTHING;
    floatw r = 0.0f, g = 0.0f, b = 0.0f, lit = 1.0f, open = 1.0f;

    if (ANYW(surface)) {
        const floatw n0 = LOADW(normal + i), n1 = LOADW(normal + i + plane), n2 = LOADW(normal + i + 2 * plane);
        const floatw unit = rsqrt(fmax(fma(n0, n0, fma(n1, n1, n2 * n2)), 1e-36f));
        const floatw nx = n0 * unit, ny = n1 * unit, nz = n2 * unit;
        const floatw rough = LOADW(roughness + i), metal = LOADW(metallic + i);
        const Facing s = facing(nx, ny, nz, -kx * inv, -ky * inv, -inv, rough);
        open = ambient_occlusion(
            ambient_depth, surface, nx, ny, nz, z, kx, ky, u0, v, width, height, pitch, fx, fy, occlusion_radius_m,
            occlusion_slices, occlusion_steps);

        floatw X, Y, Z, Nx, Ny, Nz;
        to_world(env_rotation, nx, ny, nz, &Nx, &Ny, &Nz);
        const floatw twice = 2.0f * s.NoV;
        to_world(env_rotation, fma(twice, nx, kx * inv), fma(twice, ny, ky * inv), fma(twice, nz, inv), &X, &Y, &Z);
        const Surroundings around = {env_specular, env_zonal, env_colour, env_levels, env_size, env_elevations};
        const Lobes each = lobes(env_brdf, lobe_corner(s.NoV, rough, env_brdf_size));
        const Quad A = reflection(&each, 0, LOBES_F0, &around, X, Y, Z, Nx, Ny, Nz);
        const Quad B = reflection(&each, LOBES_F0, LOBES, &around, X, Y, Z, Nx, Ny, Nz);
        const Quad E_sky = irradiance_on(&around, env_irradiance, Nx, Ny, Nz);
        const floatw shine = specular_occlusion(s.NoV, open, rough), gain = open * M_1_PI_F;
        const floatw cr = clamp(LOADW(albedo + i), 0.0f, 1.0f);
        const floatw cg = clamp(LOADW(albedo + i + plane), 0.0f, 1.0f);
        const floatw cb = clamp(LOADW(albedo + i + 2 * plane), 0.0f, 1.0f);
        const floatw fr = fma(cr - DIELECTRIC_F0, metal, DIELECTRIC_F0);
        const floatw fg = fma(cg - DIELECTRIC_F0, metal, DIELECTRIC_F0);
        const floatw fb = fma(cb - DIELECTRIC_F0, metal, DIELECTRIC_F0);
        /* A half metal is a mixture of a metal and a dielectric, of which each keeps its energy. */
        const floatw again = reflected_again(DIELECTRIC_F0, A.w, B.w);
        const floatw inside = 1.0f - fma(DIELECTRIC_F0, A.w, B.w) - again;
        const floatw dr = fma(1.0f - metal, fma(cr, inside, again), metal * reflected_again(cr, A.w, B.w));
        const floatw dg = fma(1.0f - metal, fma(cg, inside, again), metal * reflected_again(cg, A.w, B.w));
        const floatw db = fma(1.0f - metal, fma(cb, inside, again), metal * reflected_again(cb, A.w, B.w));
        r = fma(dr * gain, E_sky.x, shine * fma(fr, A.x, B.x));
        g = fma(dg * gain, E_sky.y, shine * fma(fg, A.y, B.y));
        b = fma(db * gain, E_sky.z, shine * fma(fb, A.z, B.z));

        if (sun_on) {
            const float3 L = vload3(0, sun_direction), E = vload3(0, sun_irradiance);
            const floatw NoL = exact_dot(n0, n1, n2, L.x, L.y, L.z) * unit;
            lit = sun_shadow(
                ambient_quad, surface, n0, n1, n2, NoL, z, u, (float)v, width, height, pitch, fx, fy, cx, cy, L,
                shadow_steps, shadow_distance_m, thickness_m);
            const floatw w1 = fmax(NoL, 0.0f) * lit;
            const Lobe f = lobe(s, L.x, L.y, L.z, 1.0f, NoL, fmax(NoL, 1e-18f));
            const floatw DV = w1 * s.a2 * (0.5f * M_1_PI_F) * f.H2 * f.H2 / (f.den * f.den * f.lambda);
            const floatw w3 = DV * f.schlick, w2 = DV - w3;
            const floatw pigment = w1 * (1.0f - metal) * M_1_PI_F * (1.0f - interface_share(s.NoV, rough));
            r = fma(E.x, fma(pigment, cr, fma(fr, w2, w3)), r);
            g = fma(E.y, fma(pigment, cg, fma(fg, w2, w3)), g);
            b = fma(E.z, fma(pigment, cb, fma(fb, w2, w3)), b);
            lit = SELECTW(surface, lit, 1.0f);
        }
        open = SELECTW(surface, open, 1.0f);
    }
    if (ANYW(!surface)) {
        floatw X, Y, Z;
        to_world(env_rotation, kx, (floatw)ky, 1.0f, &X, &Y, &Z);
        const Corner at = octahedral(X, Y, Z, env_backdrop_size);
        const Quad seen = bilinear(env_backdrop, at);
        r = SELECTW(surface, r, seen.x);
        g = SELECTW(surface, g, seen.y);
        b = SELECTW(surface, b, seen.z);
    }
    STOREW(r, rgb + i);
    STOREW(g, rgb + i + plane);
    STOREW(b, rgb + i + 2 * plane);
    STOREW(open, occlusion + i);
#ifdef LAYERS
    STOREW(r, ambient + i);
    STOREW(g, ambient + i + plane);
    STOREW(b, ambient + i + 2 * plane);
    STOREW(lit, shadow + i);
#endif
}
