/* snow_fall.cl - flakes near the camera. Mirrors reference_numpy/snow_fall.py.
 * Paper, supplement "Particle-based falling snow". The stages are those of particles.h.
 */
#include "include/particles.h"
#include "include/vec.h"

#define LOBE 1.0f /* roughness of the blur in which surroundings are seen through a flake */

__kernel void snow_fall_keys(
    __global uint *restrict particle_key,
    const int width, const int height,                               /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int snow_count,
    __global const uint *restrict snow_at,
    __global const int *restrict snow_corner,
    __global const float *restrict snow_axes,
    __global const float *restrict snow_move,
    const float snow_steps,
    const int seed, const float near_m, const float reach_m, const float opacity, const float aperture_mm,
    const float focus_m, const int convention)
{
    const Falling f = {
        snow_count, seed, snow_at, snow_corner, snow_axes, snow_move, snow_steps, 1.0f, fx, fy, cx, cy,
        near_m, reach_m, opacity, aperture_mm, focus_m, convention};
    const int i0 = W * get_global_id(0);
    if (i0 < snow_count)
        particle_keys(f, i0, width, height, particle_key);
}

__kernel void snow_fall_count_low(
    __global const uint *restrict particle_key, __global int *restrict particle_counts, const int snow_count)
{
    count_digit(particle_key, 0, snow_count, 0, get_global_id(0), particle_counts);
}

__kernel void snow_fall_sum_low(__global int *restrict particle_counts, __global int *restrict particle_shown)
{
    sum_counts(particle_counts, particle_shown);
}

__kernel void snow_fall_spread_low(
    __global const uint *restrict particle_key, __global int *restrict particle_counts,
    __global uint *restrict particle_by_low, const int snow_count)
{
    spread_digit(particle_key, 0, snow_count, 0, get_global_id(0), particle_counts, particle_by_low);
}

__kernel void snow_fall_count_high(
    __global const uint *restrict particle_key, __global const uint *restrict particle_by_low,
    __global int *restrict particle_counts, __global const int *restrict particle_shown)
{
    count_digit(particle_key, particle_by_low, *particle_shown, 8, get_global_id(0), particle_counts);
}

__kernel void snow_fall_sum_high(__global int *restrict particle_counts, __global int *restrict particle_shown)
{
    sum_counts(particle_counts, particle_shown);
}

__kernel void snow_fall_spread_high(
    __global const uint *restrict particle_key, __global const uint *restrict particle_by_low,
    __global int *restrict particle_counts, __global uint *restrict particle_order,
    __global const int *restrict particle_shown)
{
    spread_digit(
        particle_key, particle_by_low, *particle_shown, 8, get_global_id(0), particle_counts, particle_order);
}

__kernel void snow_fall_records(
    __global const uint *restrict particle_order,
    __global const int *restrict particle_shown,
    __global float *restrict particle_record,
    const int width, const int height,                               /* [px] */
    const float fx, const float fy, const float cx, const float cy,  /* [px] */
    const int snow_count,
    __global const uint *restrict snow_at,
    __global const int *restrict snow_corner,
    __global const float *restrict snow_axes,
    __global const float *restrict snow_move,
    const float snow_steps,
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
        snow_count, seed, snow_at, snow_corner, snow_axes, snow_move, snow_steps, 1.0f, fx, fy, cx, cy,
        near_m, reach_m, opacity, aperture_mm, focus_m, convention};
    const Light by = {
        light_count, light_kind, light_position, light_direction, light_intensity, light_shape, env_rotation,
        env_specular, env_levels, env_size, sun_direction, sun_irradiance, LOBE, g, haze_extinction, haze_color};
    const int j0 = W * get_global_id(0);
    if (j0 < *particle_shown)
        particle_records(f, by, j0, *particle_shown, width, height, particle_order, particle_record);
}

__kernel void snow_fall_bins(
    __global const float *restrict particle_record,
    __global const int *restrict particle_shown,
    __global ulong *restrict particle_bits,
    const int snow_count, const int width, const int height)
{
    for (int word = get_global_id(0); word < words_of(*particle_shown); word += get_global_size(0))
        particle_bins(particle_record, word, snow_count, *particle_shown, width, height, particle_bits);
}

__kernel void snow_fall(
    __global float *restrict rgb,                                    /* scene-linear */
    __global const float *restrict depth,                            /* [m] */
    __global const uchar *restrict sky,
#ifdef LAYERS
    __global float *restrict flake_alpha,
    __global float *restrict flake_depth,                             /* [m] */
#endif
    __global const float *restrict particle_record,
    __global const int *restrict particle_shown,
    __global const ulong *restrict particle_bits,
    const int snow_count, const int width, const int height, const int pitch, const int plane)
{
    const int u0 = W * get_global_id(0), v0 = TILE * get_global_id(1);
    Strip strip;
    particle_strip(
        &strip, particle_record, particle_bits, snow_count, *particle_shown, u0, v0, width, height, pitch, depth, sky);
    store_light(&strip, rgb, u0, v0, height, pitch, plane);
#ifdef LAYERS
    store_layers(&strip, depth, flake_alpha, flake_depth, u0, v0, height, pitch);
#endif
}
