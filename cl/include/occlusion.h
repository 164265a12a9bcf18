/* occlusion.h - horizon-based ambient occlusion. Mirrors reference_numpy/occlusion.py. */
#ifndef OCCLUSION_H
#define OCCLUSION_H
#include "gather.h"
#include "shadow.h"
#include "vec.h"

#define FIRST 2          /* [px] the nearest sample */
#define LEAST_NOV 1e-3f
#define MARGIN TILE      /* [px] of nothing on both sides of a row of depths */
#define MOST_SLICES 8
#define HIDDEN 0.0625f   /* share below which a difference of a cosine from 1 needs digits of its own */

__constant int SLICES[16] = {1, 0, 0, 1, 1, 1, -1, 1, 2, 1, -1, 2, 1, 2, -2, 1};

/* The picture's depths, and how much of them counts. */
typedef struct {
    __global const float *solid;         /* [m] with margins */
    int width, height, pitch;            /* [px] */
    float fx, fy;                        /* [px] */
    float radius_m;
    int slices, steps;
} Depths;

/* The surfaces of a vector, lengths in stretches of a pixel's ray, which makes depths of ways along it. */
typedef struct {
    floatw depth;                        /* [m] */
    floatw soft, inv_radius2;            /* added to d^2; [1/m^2] */
    floatw kx, nx, ny;
    float ky;
    floatw stretch, inv_stretch2;        /* of the ray, whose depth is 1 */
    floatw towards, n_v;                 /* the normal's part to the eye, and the same clamped */
} Surface;

/* One slice of what surrounds them. */
typedef struct {
    int way;                             /* from one depth to the next of a step [px] */
    int ahead_to, behind_to;             /* [px] the last steps that matter and end in the picture */
    floatw across, lean;                 /* of a step at depth 1: its part square to the ray, and the other over it */
    floatw length, sin_g, cos_g;         /* of the normal in the slice, g from the eye's direction */
    floatw ahead, behind;                /* 1 - cosine to the eye of the horizons */
} Slice;

/* 1 - cosine to the eye of the horizon over a thing at depth z, `way` aside at depth 1: that of the surface's own plane,
 * flat = 1 + up, drawn to the thing's own. `fine` keeps the digits of what is nearly 0. */
static inline floatw fall(
    const Surface *s, const floatw z, const floatw way, const floatw lean, const floatw up, const floatw flat,
    const bool fine)
{
    const floatw across = way * z, away = fma(across, lean, z - s->depth);
    const floatw across2 = fma(across, across, s->soft), d2 = fma(away, away, across2);
    const floatw near = fma(-d2, s->inv_radius2, 1.0f), root = SELECTW(near > 0.0f, near, 0.0f), weight = root * root;
    if (!fine)
        return fma(-weight, fma(-away, 1.0f / sqrt(d2), up), flat);
    const floatw e = across2 / fma(sqrt(d2), fabs(away), d2), q = fmin(d2 * s->inv_radius2, 1.0f);
    return fma(weight, SELECTW(away < 0.0f, e, 2.0f - e), q * (2.0f - q) * flat);
}

/* The horizons of a slice on both sides. */
static inline void look(
    __global const float *here, const Surface *s, Slice *c, const int first, const bool fine)
{
    floatw flat = 1.0f + c->sin_g, flat_behind = 1.0f - c->sin_g;
    if (fine) {
        const floatw least = c->cos_g * c->cos_g / (1.0f + fabs(c->sin_g));
        flat = SELECTW(c->sin_g < 0.0f, least, flat);
        flat_behind = SELECTW(c->sin_g > 0.0f, least, flat_behind);
    }
    floatw ahead = flat, behind = flat_behind;
    const int last = max(c->ahead_to, c->behind_to);
    for (int step = first; step <= last; step *= 2) {
        const floatw z = step <= c->ahead_to ? LOADW(here + step * c->way) : (floatw)NOTHING;
        const floatw z_behind = step <= c->behind_to ? LOADW(here - step * c->way) : (floatw)NOTHING;
        const floatw way = c->across * (float)step;
        const floatw a = fall(s, z, way, c->lean, c->sin_g, flat, fine);
        const floatw b = fall(s, z_behind, way, -c->lean, -c->sin_g, flat_behind, fine);
        ahead = SELECTW(a < ahead, a, ahead);
        behind = SELECTW(b < behind, b, behind);
    }
    c->ahead = ahead;
    c->behind = behind;
}

/* Of the arc from the eye's direction to a horizon of 1 - cosine `fall`, what is weighted by the cosine along the eye's
 * direction, and square to it, where c = 1 - fall:  (1 - c^2) / 2,  (acos c - c sqrt(1 - c^2)) / 2.
 * Jimenez et al. 2016, eq. 7, as cos g - cos(2 h - g) = 2 sin h sin(h - g). The latter goes with fall^(3/2); the fit is
 * minimax, as those of trig.h, to 1.8e-8 (relative). */
static inline floatw arc(const floatw fall, floatw *square)
{
    const floatw other = 2.0f - fall;
    const intw beyond = fall > 1.0f;
    const floatw least = SELECTW(beyond, other, fall), x = SELECTW(least > 0.0f, least, 0.0f);
    floatw p = fma(x, -2.78534015e-4f, 2.16496664e-4f);
    p = fma(x, p, -9.5005427e-4f);
    p = fma(x, p, -2.32900583e-3f);
    p = fma(x, p, -1.26499597e-2f);
    p = fma(x, p, -0.141419789f);
    p = fma(x, p, 0.942809024f);
    p *= x * sqrt(x);
    *square = SELECTW(beyond, 0.5f * M_PI_F - p, p);
    return 0.5f * fall * other;
}

/* cos g + g sin g, 0 <= cos g <= 1, of cos g; the fit is minimax, to 1.2e-8 (relative). */
static inline floatw unhidden(const floatw c)
{
    floatw p = fma(c, -3.63996661e-3f, 2.12412051e-2f);
    p = fma(c, p, -5.96315156e-2f);
    p = fma(c, p, 0.115008126f);
    p = fma(c, p, -0.190814859f);
    p = fma(c, p, 0.332352776f);
    p = fma(c, p, -0.785308956f);
    p = fma(c, p, -3.1668378e-6f);
    return fma(c, p, 1.57079635f);
}

/* [px] / focal length: no line of sight farther away comes within the radius of any of the surfaces. That of the ray r is
 * z |r x w| / |r + w| away for a step w square to the axis, and |r x w| >= |w|. */
static inline float last_step(const floatw depth, const floatw stretch, const float radius_m)
{
    return radius_m * MAXW(stretch) / fmax(MINW(depth) - radius_m, 1e-6f);
}

static inline Surface surface_at(
    const Depths *p, const floatw depth, const floatw kx, const float ky, const floatw nx, const floatw ny, const floatw nz)
{
    const floatw stretch2 = fma(kx, kx, fma(ky, ky, 1.0f));
    Surface s;
    s.depth = depth;
    s.kx = kx; s.ky = ky;
    s.nx = nx; s.ny = ny;
    s.stretch = sqrt(stretch2);
    s.inv_stretch2 = 1.0f / stretch2;
    s.soft = 1e-12f * s.inv_stretch2;
    s.inv_radius2 = stretch2 * (1.0f / (p->radius_m * p->radius_m));
    s.towards = -fma(nx, kx, fma(ny, (floatw)ky, nz)) * s.stretch * s.inv_stretch2;
    s.n_v = fmax(s.towards, LEAST_NOV);
    return s;
}

/* Steps of so many pixels, at most 2, for which there is room. */
static inline int room_for(const int by, const int room)
{
    return by == 0 ? INT_MAX : by == 1 ? room : room / 2;
}

/* Of the step w beside the ray r, |r x w| / |r| lies square to it and r.w / |r| along it. */
static inline Slice slice(
    const Depths *p, const Surface *s, const int j, const int u0, const int v, const float last, const int most)
{
    const int du = SLICES[2 * j], dv = SLICES[2 * j + 1], right = p->width - 1 - u0, left = u0 + W - 1;
    const float wx = du / p->fx, wy = dv / p->fy, w2 = fma(wx, wx, wy * wy);
    const int matter = min(most, (int)fmin(last / sqrt(w2), 1e6f));
    Slice c;
    c.way = dv * (p->pitch + 2 * MARGIN) + du;
    c.ahead_to = min(min(matter, room_for(dv, p->height - 1 - v)), room_for(abs(du), du > 0 ? right : left));
    c.behind_to = min(min(matter, room_for(dv, v)), room_for(abs(du), du > 0 ? left : right));
    const floatw along = fma(s->kx, wx, s->ky * wy), turn = fma(s->kx, wy, -s->ky * wx);
    const floatw beside2 = fma(turn, turn, w2), inv_beside = 1.0f / sqrt(beside2);
    c.across = beside2 * inv_beside * s->inv_stretch2;
    c.lean = along * inv_beside;
    const floatw n_t = fma(fma(s->nx, wx, s->ny * wy), s->stretch, along * s->towards) * inv_beside;
    const floatw length2 = fma(n_t, n_t, s->n_v * s->n_v), inv_length = 1.0f / sqrt(length2);
    c.length = length2 * inv_length;
    c.sin_g = n_t * inv_length;
    c.cos_g = s->n_v * inv_length;
    return c;
}

/* Share of the surroundings that surfaces see; `fine`: shares of nearly 0, too, to a float's digits. One after the other, a
 * slice's roots and quotients would wait for those of the slice before. */
OUT_OF_LINE floatw share_seen(const Depths *p, const Surface *s, const int u0, const int v, const int fine)
{
    Slice of[MOST_SLICES];
    const float last = last_step(s->depth, s->stretch, p->radius_m);
    const int first = FIRST * max(1, (int)(p->fx * (1.0f / 1024) + 0.5f)), most = p->steps > 0 ? first << (p->steps - 1) : 0;
    __global const float *here = p->solid + v * (p->pitch + 2 * MARGIN) + MARGIN + u0;
    for (int j = 0; j < p->slices; j++)
        of[j] = slice(p, s, j, u0, v, last, most);
    for (int j = 0; j < p->slices; j++)
        if (fine)
            look(here, s, of + j, first, true);
        else
            look(here, s, of + j, first, false);
    floatw seen = 0.0f, open = 0.0f;
    for (int j = 0; j < p->slices; j++) {
        const Slice *c = of + j;
        floatw ahead, behind;
        const floatw to_eye = arc(c->ahead, &ahead) + arc(c->behind, &behind);
        seen = fma(c->length, fma(c->cos_g, to_eye, c->sin_g * (ahead - behind)), seen);
        open = fma(c->length, unhidden(c->cos_g), open);
    }
    return clamp(seen / open, 0.0f, 1.0f);
}

/* Share of the surroundings that surfaces see, in those lanes that have one. */
static inline floatw ambient_occlusion(
    const Depths *p, const intw on, const floatw depth, const floatw kx, const float ky,
    const floatw nx, const floatw ny, const floatw nz, const int u0, const int v)
{
    const Surface s = surface_at(p, depth, kx, ky, nx, ny, nz);
    const floatw share = share_seen(p, &s, u0, v, 0);
    const intw hidden = share < HIDDEN;
    return ANYW(on & hidden) ? SELECTW(hidden, share_seen(p, &s, u0, v, 1), share) : share;
}
#endif
