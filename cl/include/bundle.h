/* bundle.h - where tiles' rays can be lit by a lamp: bounds, a few operations each for W tiles. What they leave out would have
 * added 0. */
#ifndef BUNDLE_H
#define BUNDLE_H
#include "lamp.h"
#include "tiles.h"

#define ROUNDING 1e-4f   /* relative; far more than what bounds lose by it */

/* Of a tile the rays within half_angle of the unit vector (x, y, z), of lengths up to far [m]; a lane a tile. */
typedef struct {
    floatw x, y, z, half_angle, far;
} Bundle;

static inline Bundle bundle(const Frusta a)
{
    const floatw width = a.right - a.left, height = a.bottom - a.top;
    const floatw x = fmax(fabs(a.left), fabs(a.right)), y = fmax(fabs(a.top), fabs(a.bottom));
    const floatw kx = a.left + 0.5f * width, ky = a.top + 0.5f * height;
    Bundle b;
    b.z = RSQRTW(fma(kx, kx, fma(ky, ky, 1.0f)));
    b.x = kx * b.z; b.y = ky * b.z;
    b.half_angle = 0.5f * sqrt(fma(width, width, height * height)) + ROUNDING; /* [rad] at most, off the axis less */
    b.far = a.far * sqrt(fma(x, x, fma(y, y, 1.0f)));
    return b;
}

/* A lamp beside a bundle's axis, by places y along the axis from its closest approach to the lamp [m]: light is met from
 * first to last, nowhere if first > last. rise y + h is the axial component of the way from the lamp, as much more as it may
 * be for rays of the bundle, over which cos_outer r is then exceeded most at top. */
typedef struct {
    floatw t0, D, first, last, rise, h, top;
} Met;

/* At the way x [m] rays are half_angle x from the bundle's axis at most, so that there is no light where axial - cos_outer r of
 * the axis' point is below -(1 + cos_outer) half_angle x. That is the difference of a line and a convex function: it has one
 * peak, and crosses 0 where (cos_outer^2 D^2 - h^2) / (cos_outer root +- rise h). */
static inline Met met_by(const Bundle b, const Lamp lamp, const float r_max)
{
    const float3 p = (float3)(lamp.px, lamp.py, lamp.pz), d = (float3)(lamp.dx, lamp.dy, lamp.dz);
    const float range = length(p), slack = ROUNDING * (range + r_max), co = fmax(lamp.cos_outer, 0.0f);
    const floatw x = p.y * b.z - p.z * b.y, y = p.z * b.x - p.x * b.z, z = p.x * b.y - p.y * b.x, D2 = fma(x, x, fma(y, y, z * z));
    Met m;
    m.t0 = fma(p.x, b.x, fma(p.y, b.y, p.z * b.z));
    m.D = sqrt(D2);
    const floatw most = r_max + b.half_angle * fmin(b.far, range + r_max) + slack;
    const floatw reach = sqrt(fmax(fma(most, most, -D2), 0.0f));
    m.first = fmax(-m.t0, -reach);
    m.last = SELECTW(most > m.D, fmin(fma(ROUNDING, range, b.far) - m.t0, reach), -INFINITY);
    m.rise = fma(1.0f + co, b.half_angle, fma(d.x, b.x, fma(d.y, b.y, d.z * b.z)));
    m.h = fma(m.rise, m.t0, slack) - dot(p, d);
    const floatw steep = fma(-m.rise, m.rise, co * co);
    m.top = SELECTW(
        steep > 0.0f, m.D * m.rise * RSQRTW(fmax(steep, 0.0f)), SELECTW(m.rise > 0.0f, (floatw)(INFINITY), -INFINITY));
    if (lamp.cos_outer < 0.0f)
        return m;
    const floatw at = fmin(fmax(m.top, m.first), m.last), turned = m.rise * m.h;
    const intw outside = fma(m.rise, at, m.h) < co * sqrt(fma(at, at, D2));
    const floatw root = co * sqrt(fmax(m.h * m.h - steep * D2, 0.0f)), across = co * co * D2 - m.h * m.h;
    const floatw up = across / (root + turned), down = across / (turned - root);
    const intw later = (root + turned > 0.0f) & (fma(m.rise, up, m.h) >= 0.0f) & (up <= m.top);
    const intw sooner = (root - turned > 0.0f) & (fma(m.rise, down, m.h) >= 0.0f) & (down >= m.top);
    m.first = SELECTW(later, fmax(m.first, up), m.first);
    m.last = SELECTW(outside, -INFINITY, SELECTW(sooner, fmin(m.last, down), m.last));
    return m;
}
#endif
