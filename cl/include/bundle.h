/* bundle.h - where a tile's rays can be lit by a lamp: bounds, a few scalar operations each. What they leave out would have
 * added 0. */
#ifndef BUNDLE_H
#define BUNDLE_H
#include "lamp.h"
#include "tiles.h"

#define ROUNDING 1e-4f   /* relative; far more than what bounds lose by it */

/* Rays within half_angle of the unit vector axis, of lengths up to far [m]. */
typedef struct {
    float3 axis;
    float half_angle, far;
} Bundle;

static inline Bundle bundle(const Frustum a)
{
    const float width = a.right - a.left, height = a.bottom - a.top;
    const float x = fmax(fabs(a.left), fabs(a.right)), y = fmax(fabs(a.top), fabs(a.bottom));
    Bundle b;
    b.axis = normalize((float3)(a.left + 0.5f * width, a.top + 0.5f * height, 1.0f));
    b.half_angle = 0.5f * sqrt(fma(width, width, height * height)) + ROUNDING; /* [rad] at most, off the axis less */
    b.far = a.far * sqrt(fma(x, x, fma(y, y, 1.0f)));
    return b;
}

/* A lamp beside a bundle's axis, by places y along the axis from its closest approach to the lamp [m]: light is met from
 * first to last, nowhere if first > last. rise y + h is the axial component of the way from the lamp, as much more as it may
 * be for rays of the bundle, over which cos_outer r is then exceeded most at top. */
typedef struct {
    float t0, D, first, last, rise, h, top;
} Met;

/* At the way x [m] rays are half_angle x from the bundle's axis at most, so that there is no light where axial - cos_outer r of
 * the axis' point is below -(1 + cos_outer) half_angle x. That is the difference of a line and a convex function: it has one
 * peak, and crosses 0 where (cos_outer^2 D^2 - h^2) / (cos_outer root +- rise h). */
static inline Met met_by(const Bundle b, const Lamp lamp, const float r_max)
{
    const float3 p = (float3)(lamp.px, lamp.py, lamp.pz), d = (float3)(lamp.dx, lamp.dy, lamp.dz);
    const float range = length(p), slack = ROUNDING * (range + r_max), co = fmax(lamp.cos_outer, 0.0f);
    Met m;
    m.t0 = dot(p, b.axis);
    m.D = length(cross(p, b.axis));
    const float most = r_max + b.half_angle * fmin(b.far, range + r_max) + slack, D2 = m.D * m.D;
    const float reach = sqrt(fmax(most * most - D2, 0.0f));
    m.first = fmax(-m.t0, -reach);
    m.last = most > m.D ? fmin(fma(ROUNDING, range, b.far) - m.t0, reach) : -INFINITY;
    m.rise = fma(1.0f + co, b.half_angle, dot(d, b.axis));
    m.h = fma(m.rise, m.t0, slack) - dot(p, d);
    const float steep = co * co - m.rise * m.rise;
    m.top = steep > 0.0f ? m.D * m.rise * rsqrt(steep) : m.rise > 0.0f ? INFINITY : -INFINITY;
    if (m.first > m.last || lamp.cos_outer < 0.0f)
        return m;
    const float at = clamp(m.top, m.first, m.last), turned = m.rise * m.h;
    if (fma(m.rise, at, m.h) < co * sqrt(fma(at, at, D2)))
        m.last = -INFINITY;
    const float root = co * sqrt(fmax(m.h * m.h - steep * D2, 0.0f)), across = co * co * D2 - m.h * m.h;
    const float up = across / (root + turned), down = across / (turned - root);
    if (root + turned > 0.0f && fma(m.rise, up, m.h) >= 0.0f && up <= m.top)
        m.first = fmax(m.first, up);
    if (root - turned > 0.0f && fma(m.rise, down, m.h) >= 0.0f && down >= m.top)
        m.last = fmin(m.last, down);
    return m;
}
#endif
