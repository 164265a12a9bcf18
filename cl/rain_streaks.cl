/* rain_streaks.cl - drops near the camera. Mirrors reference_numpy/rain_streaks.py.
 * Paper, supplement "Precipitation Dynamics". The stages before this last one are those of particles.h.
 */
#include "include/particles.h"
#include "include/vec.h"

__kernel void rain_streaks(
    __global float *restrict rgb,                                    /* scene-linear */
    __global const float *restrict depth,                            /* [m] */
    __global const uchar *restrict sky,
#ifdef LAYERS
    __global float *restrict streak_alpha,
    __global float *restrict streak_depth,                            /* [m] */
#endif
    __global const float *restrict particle_record,
    __global const int *restrict particle_shown,
    __global const ulong *restrict particle_bits,
    const int particle_count, const float particle_steps,
    const int width, const int height, const int pitch, const int plane)
{
    Strip strip;
    draw_particles(
        &strip, depth, sky, particle_record, particle_bits, particle_count, *particle_shown, particle_steps, width,
        height, pitch);
    store_light(&strip, rgb, height, pitch, plane);
#ifdef LAYERS
    store_layers(&strip, depth, streak_alpha, streak_depth, height, pitch);
#endif
}
