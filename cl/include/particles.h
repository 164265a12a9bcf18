/* particles.h - what falls through the air: the kernels that rain_streaks and snow_fall share. Mirrors
 * reference_numpy/particles.py.
 *
 * Nine stages, none of which waits for the host: `keys` finds the particles that show, and their steps of depth, a pack
 * of particles a work-item; these are sorted by two digits; `records` puts down what is drawn of each particle in their
 * order; `bins` says in which columns and rows of tiles it shows. The last stage, the pass' own, draws what is marked
 * there. All are as long as they must be for any number of particles.
 *
 * Given at build time: PACK vectors of particles a pack, and what sort.h and blending.h ask for.
 */
#ifndef PARTICLES_H
#define PARTICLES_H
#include "blending.h"
#include "capsules.h"
#include "particle_light.h"
#include "sort.h"
#include "vec.h"

#define KEYS 65536

/* Numbers of those of a pack from i0 on that may show; how many. */
static inline int near_view(const Falling f, const int i0, __global uint *restrict pack)
{
    const float room = 1e-5f * f.reach_m, way = f.bounds[0] + room; /* [m] `room` is more than rounding takes */
    const View across = view(f, f.fx, f.cx, f.width, way), down = view(f, f.fy, f.cy, f.height, way);
    int found = 0;
    for (int i = i0; i < min(i0 + PACK * W, f.count); i += W) {
        int may[W];
        STOREW(may_show(f, across, down, room, i), may);
        for (int j = 0; j < W; j++) {
            pack[found] = i + j; /* of no account if it may not show */
            found += may[j] != 0;
        }
    }
    return found;
}

/* Leaves those of a pack's numbers that do show, and puts down their steps of depth; how many. */
static inline int keep_shown(
    const Falling f, const float steps, const int found, __global uint *restrict pack, __global uint *restrict key)
{
    int kept = 0;
    for (int j0 = 0; j0 < found; j0 += W) {
        const intw i = listed(pack, j0, found);
        const Capsule c = capsule(f, i);
        int number[W], step[W], shows[W];
        STOREW(i, number);
        STOREW(INTW(clamp(c.z * steps, 0.0f, (float)(KEYS - 1))), step);
        STOREW(in_front(f, c), shows);
        for (int j = 0; j < min(W, found - j0); j++)
            if (shows[j]) {
                key[number[j]] = step[j];
                pack[kept++] = number[j];
            }
    }
    return kept;
}

__kernel void particle_keys(
    __global uint *restrict particle_key,
    __global uint *restrict particle_pack,
    __global int *restrict particle_packed,
    const int width, const int height,                               /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int particle_count,
    __global const uint *restrict particle_at,
    __global const int *restrict particle_corner,
    __global const float *restrict particle_axes,
    __global const float *restrict particle_move,
    __global const float *restrict particle_bounds,
    const float particle_steps, const float particle_taper,
    const int seed, const float near_m, const float reach_m, const float opacity, const float aperture_mm,
    const float focus_m, const int convention)
{
    const Falling f = {
        particle_count, seed, particle_at, particle_corner, particle_axes, particle_move, particle_bounds,
        particle_taper, fx, fy, cx, cy, width, height, near_m, reach_m, opacity, aperture_mm, focus_m, convention};
    const int i0 = PACK * W * get_global_id(0);
    if (i0 >= particle_count)
        return;
    __global uint *pack = particle_pack + i0;
    const int found = near_view(f, i0, pack);
    particle_packed[get_global_id(0)] = keep_shown(f, particle_steps, found, pack, particle_key);
}

/* The sort by the lower digit takes the numbers from the packs, a chunk of the packs at a time. */
#define PACKS ((particle_count + PACK * W - 1) / (PACK * W))

__kernel void particle_count_low(
    __global const uint *restrict particle_key, __global const uint *restrict particle_pack,
    __global const int *restrict particle_packed, __global int *restrict particle_counts, const int particle_count)
{
    const int chunk = get_global_id(0);
    clear_counts(chunk, particle_counts);
    for (int pack = chunk_begin(PACKS, chunk); pack < chunk_begin(PACKS, chunk + 1); pack++) {
        const int from = PACK * W * pack;
        count_digit(particle_key, particle_pack, from, from + particle_packed[pack], 0, chunk, particle_counts);
    }
}

__kernel void particle_sum_low(__global int *restrict particle_counts, __global int *restrict particle_shown)
{
    *particle_shown = sum_counts(particle_counts);
}

__kernel void particle_spread_low(
    __global const uint *restrict particle_key, __global const uint *restrict particle_pack,
    __global const int *restrict particle_packed, __global int *restrict particle_counts,
    __global uint *restrict particle_by_low, const int particle_count)
{
    const int chunk = get_global_id(0);
    for (int pack = chunk_begin(PACKS, chunk); pack < chunk_begin(PACKS, chunk + 1); pack++) {
        const int from = PACK * W * pack, to = from + particle_packed[pack];
        spread_digit(particle_key, particle_pack, from, to, 0, chunk, particle_counts, particle_by_low);
    }
}

__kernel void particle_count_high(
    __global const uint *restrict particle_key, __global const uint *restrict particle_by_low,
    __global int *restrict particle_counts, __global const int *restrict particle_shown)
{
    const int chunk = get_global_id(0), shown = *particle_shown;
    clear_counts(chunk, particle_counts);
    count_digit(
        particle_key, particle_by_low, chunk_begin(shown, chunk), chunk_begin(shown, chunk + 1), 8, chunk,
        particle_counts);
}

__kernel void particle_sum_high(__global int *restrict particle_counts)
{
    sum_counts(particle_counts);
}

__kernel void particle_spread_high(
    __global const uint *restrict particle_key, __global const uint *restrict particle_by_low,
    __global int *restrict particle_counts, __global uint *restrict particle_order,
    __global const int *restrict particle_shown)
{
    const int chunk = get_global_id(0), shown = *particle_shown;
    spread_digit(
        particle_key, particle_by_low, chunk_begin(shown, chunk), chunk_begin(shown, chunk + 1), 8, chunk,
        particle_counts, particle_order);
}

__kernel void particle_records(
    __global const uint *restrict particle_order,
    __global const int *restrict particle_shown,
    __global float *restrict particle_record,
    __global float *restrict particle_box,
    const int width, const int height,                               /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int particle_count,
    __global const uint *restrict particle_at,
    __global const int *restrict particle_corner,
    __global const float *restrict particle_axes,
    __global const float *restrict particle_move,
    __global const float *restrict particle_bounds,
    const float particle_taper, const float particle_lobe,
    const int seed, const float near_m, const float reach_m, const float opacity, const float aperture_mm,
    const float focus_m, const float g, const int convention,
    const int light_count,
    __global const int *restrict light_kind,
    __global const float *restrict light_position,                   /* [m] camera frame */
    __global const float *restrict light_direction,
    __global const float *restrict light_intensity,
    __global const float *restrict light_shape,
    __global const float *restrict env_rotation,
    __global const float *restrict env_specular,
    const int env_levels, const int env_size,
    __global const float *restrict sun_direction,                    /* camera frame */
    __global const float *restrict sun_irradiance,
    const float haze_extinction,                                     /* [1/m] */
    __global const float *restrict haze_color)
{
    const Falling f = {
        particle_count, seed, particle_at, particle_corner, particle_axes, particle_move, particle_bounds,
        particle_taper, fx, fy, cx, cy, width, height, near_m, reach_m, opacity, aperture_mm, focus_m, convention};
    const Light by = {
        light_count, light_kind, light_position, light_direction, light_intensity, light_shape, env_rotation,
        env_specular, env_levels, env_size, sun_direction, sun_irradiance, particle_lobe, g, haze_extinction,
        haze_color};
    const int shown = *particle_shown, share = get_global_id(0), shares = get_global_size(0);
    const int vectors = (shown + W - 1) / W;
    for (int j = share_begin(vectors, share, shares); j < share_begin(vectors, share + 1, shares); j++)
        write_records(f, by, W * j, shown, particle_order, particle_record, particle_box);
}

__kernel void particle_bins(
    __global const float *restrict particle_box,
    __global const int *restrict particle_shown,
    __global ulong *restrict particle_bits,
    const int particle_count, const int width, const int height)
{
    const int shown = *particle_shown, share = get_global_id(0), shares = get_global_size(0);
    const int bundles = bundles_of(shown);
    for (int k = share_begin(bundles, share, shares); k < share_begin(bundles, share + 1, shares); k++)
        write_bins(particle_box, k, particle_count, shown, width, height, particle_bits);
}

/* All particles before the strip of a work-item. */
static inline void draw_particles(
    Strip *strip, __global const float *restrict depth, __global const uchar *restrict sky,
    __global const float *restrict records, __global const ulong *restrict bits, const int count, const int shown,
    const float steps, const int width, const int height, const int pitch)
{
    const int u0 = W * get_global_id(0), row = get_global_id(1), columns = (width + TILE - 1) / TILE;
    const size_t stride = words_of(count);
    clear_strip(strip, u0, BAND * row, height, pitch, depth, sky);
    add_marked(strip, records, bits + u0 / TILE * stride, bits + (columns + row) * stride, shown, steps);
}
#endif
