/* spot_lights.cl - local lights on the surfaces, and emission. Mirrors reference_numpy/spot_lights.py.
 * Paper, supplement "Light Source Implementation".
 *
 * Two stages: spot_lights_tiles finds the lights that can reach a tile's surfaces; spot_lights adds them up.
 */
#include "include/brdf.h"
#include "include/bundle.h"
#include "include/lamp.h"
#include "include/tiles.h"
#include "include/vec.h"

#define PAPER 1          /* convention */
#define NEAR_EDGE 0.04f  /* of a cone's edge, as a cosine: nearer, its digits are saved */

/* Where some surface of a tile, none nearer than `near`, may be in a lamp's reach and cone. */
static inline intw meets_surfaces(const Bundle rays, const floatw near, const Lamp lamp, const float r_max)
{
    const Met m = met_by(rays, lamp, r_max);
    return (m.first <= m.last) & (m.last >= near * (1.0f - ROUNDING) - m.t0 - ROUNDING * fabs(m.t0));
}

__kernel void spot_lights_tiles(
    __global const float *restrict depth,               /* [m] */
    __global const uchar *restrict sky,
    __global uint *restrict tile_lights,                /* a bit a light, (light_count + 31) / 32 words a tile */
    const int width, const int height, const int pitch, /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,      /* [m] camera frame */
    __global const float *restrict light_direction,
    __global const float *restrict light_r_max,         /* [m] */
    __global const float *restrict light_shape,
    __global const float *restrict light_ball)          /* [m] centre and radius of what a lamp can light */
{
    const int words = (light_count + 31) / 32, columns = (width + TILE - 1) / TILE, first = get_global_id(0) * W;
    __global uint *restrict row = tile_lights + words * columns * get_global_id(1);
    const Frusta tiles = frusta(depth, sky, -INFINITY, pitch, height, first * TILE, get_global_id(1) * TILE, fx, fy, cx, cy);
    const Bundle rays = bundle(tiles);
    for (int word = 0; word < words; word++) {
        uintw bits = 0;
        for (int l = 32 * word; l < min(32 * word + 32, light_count); l++) {
            intw lit = meets(tiles, vload4(l, light_ball));
            if (light_kind[l] != DIRECTIONAL && ANYW(lit))
                lit &= meets_surfaces(rays, tiles.near, lamp(l, light_position, light_direction, light_shape), light_r_max[l]);
            bits |= bit_of(l, lit);
        }
        store_word(bits, row, first, columns, word, words);
    }
}

/* A vector of surfaces. */
typedef struct {
    Facing facing;
    floatw x, y, z;      /* [m] camera frame */
    floatw x_lo, y_lo;   /* what rounding took off x and y */
} Surface;

/* a / b with all its digits, by b's reciprocal. */
static inline floatw quotient(const floatw a, const float b, const float inv_b)
{
    const floatw q = a * inv_b;
    return fma(fma(-q, b, a), inv_b, q);
}

/* The surfaces at depth z (du, dv) pixels from the middle, with normals n and roughness. */
static inline Surface at_pixels(
    const floatw du, const float dv, const floatw z, const float fx, const float fy,
    const floatw nx, const floatw ny, const floatw nz, const floatw roughness)
{
    const float inv_fx = 1.0f / fx, inv_fy = 1.0f / fy;
    const floatw kx = quotient(du, fx, inv_fx), ky = quotient(dv, fy, inv_fy);
    const floatw inv = RSQRTW(fma(kx, kx, fma(ky, ky, 1.0f)));
    Surface a;
    a.facing = facing(nx, ny, nz, -kx * inv, -ky * inv, -inv, roughness);
    a.x = kx * z; a.y = ky * z; a.z = z;
    a.x_lo = fma(kx, z, -a.x) + fma(-kx, fx, du) * (inv_fx * z);
    a.y_lo = fma(ky, z, -a.y) + fma(-ky, fy, dv) * (inv_fy * z);
    return a;
}

/* The lights, as the kernel gets them. */
typedef struct {
    __global const int *kind;
    __global const float *position, *direction, *shape;
} Lights;

/* One light as the surfaces meet it: from the direction inv p, as strong as light / soft. */
typedef struct {
    floatw px, py, pz, inv;
    floatw nop, NoL;     /* n.p; n.l, clamped */
    floatw light;        /* S W NoL */
    floatw soft;         /* d^2 + eps */
} Incoming;

/* cos - cos_outer of a spot, with its digits near the edge. */
static inline floatw beside_edge(const Lights lights, const int l, const Surface a, const floatw inv)
{
    const Lamp lit = lamp(l, lights.position, lights.direction, lights.shape);
    const floatw x = a.x - lit.px, y = a.y - lit.py, z = a.z - lit.pz;
    return at_cone_edge(
        lit, x, y, z, a.x_lo + off_difference(a.x, lit.px, x), a.y_lo + off_difference(a.y, lit.py, y),
        off_difference(a.z, lit.pz, z), inv);
}

static inline Incoming incoming(const Lights lights, const int l, const Surface a)
{
    __global const float *position = lights.position + 3 * l, *direction = lights.direction + 3 * l;
    __global const float *shape = lights.shape + 4 * l;
    Incoming in;
    floatw reach = 1.0f, c = 2.0f; /* root of the window W; cos - cos_outer */
    if (lights.kind[l] == DIRECTIONAL) {
        in.px = -direction[0]; in.py = -direction[1]; in.pz = -direction[2];
        in.inv = 1.0f;
        in.soft = 1.0f;
    } else {
        in.px = position[0] - a.x; in.py = position[1] - a.y; in.pz = position[2] - a.z;
        const floatw d2 = fma(in.px, in.px, fma(in.py, in.py, in.pz * in.pz));
        in.inv = RSQRTW(d2);
        in.soft = d2 + EPSILON;
        const floatw q = fmin(d2 * shape[3] * shape[3], 1.0f);
        reach = fma(-q, q, 1.0f);
        if (shape[0] >= 0.0f)
            c = fma(-fma(in.px, direction[0], fma(in.py, direction[1], in.pz * direction[2])), in.inv, -shape[0]);
    }
    in.nop = fma(a.facing.nx, in.px, fma(a.facing.ny, in.py, a.facing.nz * in.pz));
    in.NoL = fmax(in.nop, 0.0f) * in.inv;
    if (ANYW(fabs(c - 0.5f * NEAR_EDGE) < 0.501f * NEAR_EDGE)) /* outside, but for rounding, there is no light */
        c = beside_edge(lights, l, a, in.inv);
    const floatw root = clamp(c * shape[2], 0.0f, 1.0f) * reach;
    in.light = root * root * in.NoL;
    return in;
}

/* Sums over the lights of what goes to the pigment (1), to F0 (2) and to white (3), as F = F0 (1 - m^5) + m^5. */
typedef struct {
    floatw r1, g1, b1, r2, g2, b2, r3, g3, b3;
} Sums;

/* Adds a light to the sums; one division serves distance, D and V. */
static inline void add(Sums *sums, const Facing s, const Incoming in, __global const float *intensity, const int convention)
{
    const Lobe f = lobe(s, in.px, in.py, in.pz, in.inv, in.nop, in.NoL);
    const floatw den2 = f.den * f.den;
    const floatw q = in.light / (den2 * in.soft * f.lambda);
    const floatw w1 = q * (den2 * f.lambda);
    floatw w2 = q * (f.H2 * f.H2);
    if (convention == PAPER)
        w2 /= 4.0f * s.NoV * fmax(in.NoL, 1e-18f);
    const floatw w3 = w2 * f.schlick;
    const float r = intensity[0], g = intensity[1], b = intensity[2];
    sums->r1 = fma(w1, r, sums->r1); sums->g1 = fma(w1, g, sums->g1); sums->b1 = fma(w1, b, sums->b1);
    sums->r2 = fma(w2, r, sums->r2); sums->g2 = fma(w2, g, sums->g2); sums->b2 = fma(w2, b, sums->b2);
    sums->r3 = fma(w3, r, sums->r3); sums->g3 = fma(w3, g, sums->g3); sums->b3 = fma(w3, b, sums->b3);
}

/* What the surfaces send to the eye, one colour: c of the albedo, the three sums of that colour. */
static inline floatw reflected(
    const floatw c, const floatw metal, const floatw pigment, const floatw lobe, const floatw w1, const floatw w2, const floatw w3)
{
    const floatw albedo = clamp(c, 0.0f, 1.0f);
    const floatw f0 = fma(albedo - DIELECTRIC_F0, metal, DIELECTRIC_F0);
    return fma(pigment * albedo, w1, lobe * fmax(fma(f0, w2 - w3, w3), 0.0f));
}

__kernel void spot_lights(
    __global float *restrict direct,                    /* scene-linear */
    __global const float *restrict depth,               /* [m] */
    __global const float *restrict normal,
    __global const float *restrict albedo,
    __global const float *restrict roughness,
    __global const float *restrict metallic,
    __global const float *restrict emissive,
    __global const uchar *restrict sky,
    __global const uint *restrict tile_lights,
    const int width,                                    /* [px] */
    const int pitch,                                    /* [px] row length, a multiple of W */
    const int plane,                                    /* [px] distance between the planes of one image */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,      /* [m] camera frame */
    __global const float *restrict light_direction,
    __global const float *restrict light_intensity,
    __global const float *restrict light_shape,
    const int convention)
{
    const int u0 = get_global_id(0) * W;
    const int v = get_global_id(1);
    const int i = v * pitch + u0;
    const int words = (light_count + 31) / 32;
    __global const uint *restrict reaching = tile_lights + words * (v / TILE * ((width + TILE - 1) / TILE) + u0 / TILE);

    FETCH3(emissive + i, plane);
    FETCH(depth + i);
    if (reaching[u0 + AHEAD < width ? AHEAD / TILE * words : 0]) {
        FETCH3(normal + i, plane);
        FETCH3(albedo + i, plane);
        FETCH(roughness + i);
        FETCH(metallic + i);
    }
    floatw r = LOADW(emissive + i), g = LOADW(emissive + i + plane), b = LOADW(emissive + i + 2 * plane);
    const floatw z = LOADW(depth + i);
    const intw surface = !LOADMASKW(sky + i) & (z < INFINITY);
    uint any_light = 0;
    for (int word = 0; word < words; word++)
        any_light |= reaching[word];
    if (any_light && ANYW(surface)) {
        const Lights lights = {light_kind, light_position, light_direction, light_shape};
        const floatw n0 = LOADW(normal + i), n1 = LOADW(normal + i + plane), n2 = LOADW(normal + i + 2 * plane);
        const floatw unit = RSQRTW(fma(n0, n0, fma(n1, n1, n2 * n2)));
        const floatw rough = LOADW(roughness + i), metal = LOADW(metallic + i);
        const Surface a = at_pixels(
            (float)u0 + LANES - cx, (float)v - cy, SELECTW(surface, z, 1.0f), fx, fy, n0 * unit, n1 * unit, n2 * unit, rough);
        Sums sums = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
        for (int word = 0; word < words; word++) {
            for (uint bits = reaching[word]; bits; bits &= bits - 1) {
                const int l = lowest(word, bits);
                const Incoming in = incoming(lights, l, a);
                if (ANYW(in.light > 0.0f))
                    add(&sums, a.facing, in, light_intensity + 3 * l, convention);
            }
        }
        const floatw lobe = SELECTW(surface, a.facing.a2 * (0.5f * M_1_PI_F), 0.0f);
        floatw pigment = SELECTW(surface, (1.0f - metal) * M_1_PI_F, 0.0f);
        if (convention != PAPER)
            pigment *= 1.0f - interface_share(a.facing.NoV, rough);
        r += reflected(LOADW(albedo + i), metal, pigment, lobe, sums.r1, sums.r2, sums.r3);
        g += reflected(LOADW(albedo + i + plane), metal, pigment, lobe, sums.g1, sums.g2, sums.g3);
        b += reflected(LOADW(albedo + i + 2 * plane), metal, pigment, lobe, sums.b1, sums.b2, sums.b3);
    }
    STOREW(r, direct + i);
    STOREW(g, direct + i + plane);
    STOREW(b, direct + i + 2 * plane);
}
