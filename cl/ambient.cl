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
    const int width,                                    /* [px] */
    const int pitch)                                    /* [px] row length, a multiple of W */
{
    const int u0 = get_global_id(0) * W, v = get_global_id(1), i = v * pitch + u0;
    __global float *restrict row = ambient_depth + v * (pitch + 2 * MARGIN) + MARGIN;
    const intw nothing = LOADMASKW(sky + i) | ((float)u0 + LANES >= (float)width);
    STOREW(SELECTW(nothing, NOTHING, fmin(LOADW(depth + i), NOTHING)), row + u0);
    for (int j = 0; u0 == 0 && j < MARGIN; j++)
        row[j - MARGIN] = row[pitch + j] = NOTHING;
}

static inline float solid_or_nothing(
    __global const float *restrict solid, const int x, const int y, const int height, const int pitch)
{
    return y >= 0 && y < height ? solid[y * (pitch + 2 * MARGIN) + MARGIN + x] : NOTHING;
}

/* Quads of part of a row, told by their upper left pixels. */
static inline void write_quads(
    __global float *restrict quads, __global const float *restrict solid, const int from, const int to, const int y,
    const int height, const int pitch)
{
    for (int x = from; x < to; x++) {
        float4 q;
        q.x = solid_or_nothing(solid, x, y, height, pitch);
        q.y = solid_or_nothing(solid, x + 1, y, height, pitch);
        q.z = solid_or_nothing(solid, x, y + 1, height, pitch);
        q.w = solid_or_nothing(solid, x + 1, y + 1, height, pitch);
        vstore4(q, (y + 1) * (pitch + 1) + x + 1, quads);
    }
}

__kernel void ambient_quads(
    __global float *restrict ambient_quad,
    __global const float *restrict ambient_depth,
    const int height,                                   /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int sun_on)
{
    if (!sun_on)
        return;
    const int u0 = get_global_id(0) * W, v = get_global_id(1);
    const int from = u0 == 0 ? -1 : u0;
    write_quads(ambient_quad, ambient_depth, from, u0 + W, v, height, pitch);
    if (v == 0)
        write_quads(ambient_quad, ambient_depth, from, u0 + W, -1, height, pitch);
}

/* Share of white surroundings' light that leaves the microfacets after more than one reflection. Fdez-Aguera 2019. */
static inline floatw reflected_again(const floatw F0, const floatw A, const floatw B)
{
    const floatw mean = fma(F0, 20.0f / 21, 1.0f / 21), more = mean * (1.0f - (A + B));
    return fma(F0, A, B) * more / (1.0f - more);
}

/* What the kernel is given; its body is out of line. */
typedef struct {
    __global float *rgb;                                /* scene-linear */
    __global float *occlusion;
    __global const float *normal;
    __global const float *albedo;
    __global const float *roughness;
    __global const float *metallic;
    __global const float *quads;                        /* of depths */
#ifdef LAYERS
    __global float *ambient;
    __global float *shadow;
#endif
    int plane;                                          /* [px] distance between the planes of one image */
    float cx, cy;                                       /* [px] */
    Depths depths;
    __global const float *env_rotation;                 /* camera to world */
    __global const float *env_irradiance;
    __global const float *env_brdf;
    __global const float *env_backdrop;
    Surroundings surroundings;
    int env_brdf_size, env_backdrop_size;
    __global const float *sun_direction;                /* towards the sun, camera frame */
    __global const float *sun_irradiance;
    int sun_on, shadow_steps;
    float shadow_distance_m, thickness_m;               /* [m] */
} Frame;

/* The surfaces of a vector. */
typedef struct {
    floatw depth, kx;                                   /* of their rays (kx, ky, 1) */
    float ky;
    floatw n0, n1, n2, unit;                            /* the normal's parts, and 1 over its length */
    floatw rough, metal;
    floatw cr, cg, cb;                                  /* albedo */
    floatw fr, fg, fb;                                  /* of it what a mirror of them reflects */
    Facing facing;
} Matter;

static inline Matter matter(const Frame *f, const int i, const floatw depth, const floatw kx, const float ky)
{
    const int plane = f->plane;
    const floatw inv = 1.0f / sqrt(fma(kx, kx, fma(ky, ky, 1.0f)));
    Matter m;
    m.depth = depth;
    m.kx = kx;
    m.ky = ky;
    m.n0 = LOADW(f->normal + i);
    m.n1 = LOADW(f->normal + i + plane);
    m.n2 = LOADW(f->normal + i + 2 * plane);
    m.unit = 1.0f / sqrt(max(fma(m.n0, m.n0, fma(m.n1, m.n1, m.n2 * m.n2)), 1e-36f));
    m.rough = LOADW(f->roughness + i);
    m.metal = LOADW(f->metallic + i);
    m.cr = clamp(LOADW(f->albedo + i), 0.0f, 1.0f);
    m.cg = clamp(LOADW(f->albedo + i + plane), 0.0f, 1.0f);
    m.cb = clamp(LOADW(f->albedo + i + 2 * plane), 0.0f, 1.0f);
    m.fr = fma(m.cr - DIELECTRIC_F0, m.metal, DIELECTRIC_F0);
    m.fg = fma(m.cg - DIELECTRIC_F0, m.metal, DIELECTRIC_F0);
    m.fb = fma(m.cb - DIELECTRIC_F0, m.metal, DIELECTRIC_F0);
    m.facing = facing(m.n0 * m.unit, m.n1 * m.unit, m.n2 * m.unit, -kx * inv, -ky * inv, -inv, m.rough);
    return m;
}

/* What of the light of the surroundings surfaces send back, of which they see `open`. */
static inline Quad reflected(const Frame *f, const Matter *m, const floatw open)
{
    const Facing *s = &m->facing;
    const floatw twice = 2.0f * s->NoV, inv = 1.0f / sqrt(fma(m->kx, m->kx, fma(m->ky, m->ky, 1.0f)));
    Mirroring d;
    to_world(f->env_rotation, s->nx, s->ny, s->nz, &d.nx, &d.ny, &d.nz);
    to_world(
        f->env_rotation, fma(twice, s->nx, m->kx * inv), fma(twice, s->ny, m->ky * inv), fma(twice, s->nz, inv),
        &d.mx, &d.my, &d.mz);
    const Lobes each = lobes(f->env_brdf, lobe_corner(s->NoV, m->rough, f->env_brdf_size));
    const Received from = received(&each, &f->surroundings, f->env_irradiance, &d);
    const floatw shine = specular_occlusion(s->NoV, open, m->rough), gain = open * M_1_PI_F, metal = m->metal;
    /* A half metal is a mixture of a metal and a dielectric, of which each keeps its energy. */
    const floatw A = from.A.w, B = from.B.w, again = reflected_again(DIELECTRIC_F0, A, B);
    const floatw inside = 1.0f - fma(DIELECTRIC_F0, A, B) - again;
    const floatw dr = fma(1.0f - metal, fma(m->cr, inside, again), metal * reflected_again(m->cr, A, B));
    const floatw dg = fma(1.0f - metal, fma(m->cg, inside, again), metal * reflected_again(m->cg, A, B));
    const floatw db = fma(1.0f - metal, fma(m->cb, inside, again), metal * reflected_again(m->cb, A, B));
    const Quad L = {
        fma(dr * gain, from.E.x, shine * fma(m->fr, from.A.x, from.B.x)),
        fma(dg * gain, from.E.y, shine * fma(m->fg, from.A.y, from.B.y)),
        fma(db * gain, from.E.z, shine * fma(m->fb, from.A.z, from.B.z)),
        0.0f};
    return L;
}

/* Adds the sun's light; the share of it that arrives. */
static inline floatw add_sun(
    const Frame *f, const Matter *m, const intw surface, const floatw u, const int v, Quad *restrict L)
{
    const Depths *p = &f->depths;
    const Facing *s = &m->facing;
    const float3 to = vload3(0, f->sun_direction), E = vload3(0, f->sun_irradiance);
    const floatw NoL = exact_dot(m->n0, m->n1, m->n2, to.x, to.y, to.z) * m->unit;
    const floatw lit = sun_shadow(
        f->quads, surface, m->n0, m->n1, m->n2, NoL, m->depth, u, (float)v, p->width, p->height, p->pitch,
        p->fx, p->fy, f->cx, f->cy, to, f->shadow_steps, f->shadow_distance_m, f->thickness_m);
    const floatw w1 = fmax(NoL, 0.0f) * lit;
    const Lobe h = lobe(*s, to.x, to.y, to.z, 1.0f, NoL, fmax(NoL, 1e-18f));
    const floatw DV = w1 * s->a2 * (0.5f * M_1_PI_F) * h.H2 * h.H2 / (h.den * h.den * h.lambda);
    const floatw w3 = DV * h.schlick, w2 = DV - w3;
    const floatw pigment = w1 * (1.0f - m->metal) * M_1_PI_F * (1.0f - interface_share(s->NoV, m->rough));
    L->x = fma(E.x, fma(pigment, m->cr, fma(m->fr, w2, w3)), L->x);
    L->y = fma(E.y, fma(pigment, m->cg, fma(m->fg, w2, w3)), L->y);
    L->z = fma(E.z, fma(pigment, m->cb, fma(m->fb, w2, w3)), L->z);
    return lit;
}

/* Puts what the sky shows where there is no surface. */
static inline void put_sky(const Frame *f, const intw surface, const floatw kx, const float ky, Quad *restrict L)
{
    floatw X, Y, Z;
    to_world(f->env_rotation, kx, (floatw)ky, 1.0f, &X, &Y, &Z);
    const Quad seen = bilinear(f->env_backdrop, octahedral(X, Y, Z, f->env_backdrop_size));
    L->x = SELECTW(surface, L->x, seen.x);
    L->y = SELECTW(surface, L->y, seen.y);
    L->z = SELECTW(surface, L->z, seen.z);
}

static inline void fetch(const Frame *f, const int i)
{
    FETCH3(f->normal + i, f->plane);
    FETCH3(f->albedo + i, f->plane);
    FETCH(f->roughness + i);
    FETCH(f->metallic + i);
    FETCH3_TO_CHANGE(f->rgb + i, f->plane);
    FETCH_TO_CHANGE(f->occlusion + i);
}

/* Lights the pixels (u0 to u0 + W - 1, v). */
OUT_OF_LINE void light(const Frame *f, const int u0, const int v)
{
    const Depths *p = &f->depths;
    const int i = v * p->pitch + u0, plane = f->plane;
    fetch(f, i);
    const floatw u = (float)u0 + LANES, kx = (u - f->cx) / p->fx;
    const float ky = ((float)v - f->cy) / p->fy;
    const floatw z = LOADW(p->solid + v * (p->pitch + 2 * MARGIN) + MARGIN + u0);
    const intw surface = z < NOTHING;
    Quad L = {0.0f, 0.0f, 0.0f, 0.0f};
    floatw lit = 1.0f, open = 1.0f;
    if (ANYW(surface)) {
        const Matter m = matter(f, i, z, kx, ky);
        open = ambient_occlusion(p, surface, z, kx, ky, m.facing.nx, m.facing.ny, m.facing.nz, u0, v);
        L = reflected(f, &m, open);
        if (f->sun_on)
            lit = SELECTW(surface, add_sun(f, &m, surface, u, v, &L), 1.0f);
        open = SELECTW(surface, open, 1.0f);
    }
    if (ANYW(!surface))
        put_sky(f, surface, kx, ky, &L);
    STOREW(L.x, f->rgb + i);
    STOREW(L.y, f->rgb + i + plane);
    STOREW(L.z, f->rgb + i + 2 * plane);
    STOREW(open, f->occlusion + i);
#ifdef LAYERS
    STOREW(L.x, f->ambient + i);
    STOREW(L.y, f->ambient + i + plane);
    STOREW(L.z, f->ambient + i + 2 * plane);
    STOREW(lit, f->shadow + i);
#endif
}

__kernel void ambient(
    __global float *restrict rgb,                       /* scene-linear */
    __global float *restrict occlusion,
    __global const float *restrict ambient_depth,       /* [m] NOTHING in the sky, with margins */
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
    const Surroundings surroundings = {env_specular, env_zonal, env_colour, env_levels, env_size, env_elevations};
    const Depths depths = {
        ambient_depth, width, height, pitch, fx, fy, occlusion_radius_m, occlusion_slices, occlusion_steps};
    const Frame f = {
        rgb, occlusion, normal, albedo, roughness, metallic, ambient_quad,
#ifdef LAYERS
        ambient, shadow,
#endif
        plane, cx, cy, depths, env_rotation, env_irradiance, env_brdf, env_backdrop, surroundings, env_brdf_size,
        env_backdrop_size, sun_direction, sun_irradiance, sun_on, shadow_steps, shadow_distance_m, thickness_m};
    light(&f, get_global_id(0) * W, get_global_id(1));
}
