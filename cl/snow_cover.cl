/* snow_cover.cl - snow that lies on surfaces. Mirrors reference_numpy/snow_cover.py.
 * Paper, supp. "Metaball-based surface snow" and "Material blending".
 *
 * Lattices are those of the world or of a vehicle's frame; the lanes of a vector are served frame by frame, nearly always
 * one. Places are carried as hi + lo (world.h), so that a ball's rim and a rut's side are where the reference has them.
 */
#include "include/exp.h"
#include "include/noise.h"
#include "include/ramps.h"
#include "include/vec.h"
#include "include/world.h"

#define PAPER 1          /* convention */
#define LEVELS 3
#define RADIUS 1.25f     /* of a ball, in cells; its centre is at most JITTER aside */
#define JITTER 0.75f
#define MEAN 2.6875343f  /* over the plane of the sum of all balls: 2.19 pi / 4 RADIUS^2 */
#define POLY6 1.5666815f /* W(0, rho) rho^3 */
#define WEIGHT 0.8f      /* of the printed blend */
#define BIAS 0.03f
#define EDGE 0.08f       /* [m] half the width over which a rut's side rises */
#define SHOULDER 0.5f    /* [m] beyond the ruts, over which the untouched snow begins */
#define NEARER 1.001f
#define WOBBLE 0.1f      /* [m] that ruts wander to either side */
#define FRAME 24         /* values of a frame in vehicle_frame */
#define SEGMENT 7        /* values of a piece in track_segment */

__constant int CELLS[LEVELS] = {400, 600, 900}; /* a block */
__constant float AMPLITUDE[LEVELS] = {1.0f, 0.7f, 0.49f};
__constant uint SEEDS[LEVELS] = {0x51u, 0x52u, 0x53u};
__constant int PATCHES[LEVELS] = {50, 100, 200}; /* cells a block */
__constant uint PATCH_SEEDS[LEVELS] = {0x61u, 0x62u, 0x63u};

/* The snow on one frame's lattice: height, and its slopes along the frame's x and z. */
typedef struct {
    floatw height, along_x, along_z;
} Snow;

/* Sums of one cascade's kernels at the place (u, w) in the cell (column, row), cells of 1. */
static inline Snow cascade(const intw column, const intw row, const floatw u, const floatw w, const uint seed)
{
    Snow s = {0.0f, 0.0f, 0.0f};
    for (int j = -1; j < 3; j++) {
        const uintw along = hash_row(row + j, seed);
        const floatw to_row = w + (JITTER - j);
        for (int i = -1; i < 3; i++) {
            const uintw h = hash2(column + i, along);
            const floatw dx = fma(FLOATW(h & 2047u), -JITTER / 1024.0f, u + (JITTER - i));
            const floatw dz = fma(FLOATW((h >> 11) & 2047u), -JITTER / 1024.0f, to_row);
            const floatw weight = fma(FLOATW(h >> 22), 0.4f / 1023.0f, 0.8f);
            const floatw r2 = fma(dx, dx, dz * dz);
            const floatw inside = fmax(fma(r2, -1.0f / (RADIUS * RADIUS), 1.0f), 0.0f);
            const floatw steep = weight * inside * inside;
            s.height = fma(steep, inside, s.height);
            s.along_x = fma(steep, dx, s.along_x);
            s.along_z = fma(steep, dz, s.along_z);
        }
    }
    return s;
}

/* Heights and slopes for a depth of 1 m; bumps smaller than a pixel's footprint are left out of the slopes. */
static inline Snow metaballs(
    const Place place, const int block_x, const int block_z, const floatw footprint2, const bool paper)
{
    Snow sum = {0.0f, 0.0f, 0.0f};
    for (int level = 0; level < LEVELS; level++) {
        /* Half a cell further on, so that the cells around are those of the four nearest centres. */
        const int cells = CELLS[level];
        const float shift = -0.5f * BLOCK / cells;
        const Sharp back = {shift, -fma(shift, (float)cells, 0.5f * BLOCK) / cells};
        floatw u, w;
        const intw column = cells_of(sharp_sum(place.x, back), block_x, cells, &u);
        const intw row = cells_of(sharp_sum(place.z, back), block_z, cells, &w);
        const Snow s = cascade(column, row, u, w, SEEDS[level]);
        const float radius = RADIUS * BLOCK / cells;
        const float amplitude = AMPLITUDE[level] * (paper ? POLY6 / (radius * radius * radius) : 1.0f / MEAN);
        const floatw small = fma(footprint2, 4.0f / (radius * radius), 1.0f);
        const floatw seen = amplitude * (-6.0f / (RADIUS * radius)) / (small * small);
        sum.height = fma(s.height, amplitude, sum.height);
        sum.along_x = fma(s.along_x, seen, sum.along_x);
        sum.along_z = fma(s.along_z, seen, sum.along_z);
    }
    return sum;
}

/* Noise of metres' size, 0 to 1, that thins the snow on the road, and the largest octave of it alone. */
static inline floatw patches(const Place place, const int block_x, const int block_z, floatw *octave)
{
    floatw fbm = 0.0f;
    for (int o = 0; o < LEVELS; o++) {
        floatw u, w;
        const intw column = cells_of(place.x, block_x, PATCHES[o], &u);
        const intw row = cells_of(place.z, block_z, PATCHES[o], &w);
        const floatw noise = value_noise(column, row, u, w, PATCH_SEEDS[o]);
        *octave = o == 0 ? noise : *octave;
        fbm = fma(noise, (float)(4 >> o) / 7.0f, fbm);
    }
    return smooth_ramp((fbm - 0.3f) * (1.0f / 0.4f));
}

/* Squared distance of places to one piece of a way, and on which side of it they are; the difference across it keeps its digits a kilometre along it. */
static inline floatw distance2(const Place place, __global const float *restrict piece, floatw *side)
{
    const Sharp mx = {-piece[0], -piece[1]}, mz = {-piece[2], -piece[3]};
    const Sharp qx = sharp_sum(place.x, mx), qz = sharp_sum(place.z, mz);
    const Sharp across = sharp_sum(sharp_product(qx, piece[5], 0.0f), sharp_product(qz, -piece[4], 0.0f));
    const floatw a = across.hi + across.lo;
    const floatw beyond = fmax(fabs(fma(qx.hi, piece[4], qz.hi * piece[5])) - piece[6], 0.0f);
    *side = SELECTW(a < 0.0f, -1.0f, 1.0f);
    return fma(a, a, beyond * beyond);
}

/* Whether a piece comes within reach [m] of the circle around (x, z). */
static inline bool is_near(__global const float *restrict piece, const float x, const float z, const float reach)
{
    const float qx = x - piece[0], qz = z - piece[2];
    const float across = fabs(qx * piece[5] - qz * piece[4]);
    const float beyond = fabs(qx * piece[4] + qz * piece[5]) - piece[6];
    return across < reach && beyond < reach;
}

/* From a to 1 by a share. 1 - (1 - a) (1 - share) would round to the digits of 1. */
static inline floatw up_to_one(const float a, const floatw share)
{
    return fma(1.0f - share, (floatw)a, share);
}

/* Share of the snow that vehicles have left on the lanes `wanted`, 1 where none drove. */
static inline floatw kept_in_tracks(
    const Place place, const floatw wobble, const intw wanted,
    __global const float *restrict track_segment, __global const int *restrict track_path, const int track_count,
    const float gauge, const float width, const float share, const float middle)
{
    const float left = MINW(SELECTW(wanted, place.x.hi, 1e9f)), right = MAXW(SELECTW(wanted, place.x.hi, -1e9f));
    const float back = MINW(SELECTW(wanted, place.z.hi, 1e9f)), front = MAXW(SELECTW(wanted, place.z.hi, -1e9f));
    const float x = 0.5f * (left + right), z = 0.5f * (back + front);
    /* A centimetre more than the profile is wide, for what rounding does to the test. */
    const float reach = 0.5f * (gauge + fmax(width, 2.0f * SHOULDER)) + EDGE + WOBBLE + 0.01f
        + 0.5f * (right - left + front - back);
    floatw kept = 1.0f;
    for (int path = 0; path < track_count; path++) {
        floatw nearest2 = 1e12f, side = 1.0f;
        bool found = false;
        for (int i = track_path[path]; i < track_path[path + 1]; i++) {
            __global const float *piece = track_segment + SEGMENT * i;
            if (is_near(piece, x, z, reach)) {
                floatw there;
                const floatw d2 = distance2(place, piece, &there);
                side = SELECTW(d2 * NEARER < nearest2, there, side);
                nearest2 = fmin(nearest2, d2);
                found = true;
            }
        }
        if (!found)
            continue;
        const floatw aside = fabs(fma(side, sqrt(nearest2), wobble)) - 0.5f * gauge;
        const floatw off_rut = smooth_ramp((fabs(aside) - (0.5f * width - EDGE)) * (0.5f / EDGE));
        const floatw off_lane = smooth_ramp(aside * (1.0f / SHOULDER));
        kept = fmin(kept, up_to_one(share, off_rut) * up_to_one(middle, off_lane));
    }
    return kept;
}

/* a b + c d + e f - g with what its rounding takes off: near 0 it has all its digits. */
static inline floatw dot_less(
    const floatw a, const float b, const floatw c, const float d, const floatw e, const float f, const float g)
{
    const Sharp x = {a, 0.0f}, y = {c, 0.0f}, z = {e, 0.0f}, less = {-g, 0.0f};
    const Sharp xy = sharp_sum(sharp_product(x, b, 0.0f), sharp_product(y, d, 0.0f));
    const Sharp sum = sharp_sum(sharp_sum(xy, sharp_product(z, f, 0.0f)), less);
    return sum.hi + sum.lo;
}

/* log(1 + y) for small y, |y| <= 1/16. */
static inline floatw log_near_one(const floatw y)
{
    floatw p = fma(y, -0.16666667f, 0.2f);
    p = fma(y, p, -0.25f);
    p = fma(y, p, 0.33333333f);
    p = fma(y, p, -0.5f);
    return fma(y * y, p, y);
}

/* Share of the surface that a height of snow hides, c^gamma with c below 1; *bare is 1 less that, to all its digits. */
static inline floatw coverage(
    const floatw height, const float cover_cm, const float gamma, const int convention, floatw *bare)
{
    floatw log_c;
    if (convention == PAPER) {
        const floatw E = exp_negative(-WEIGHT * (height - BIAS));
        log_c = -SELECTW(E < 0.0625f, log_near_one(E), log(1.0f + E));
    } else {
        const floatw x = height * (100.0f / cover_cm), T = exp_negative(-x);
        log_c = SELECTW(T < 0.0625f, log_near_one(-T), log(fmax(one_minus_exp(x, T), 1e-37f)));
    }
    const floatw hidden = exp_negative(gamma * log_c);
    const intw none = (height == 0.0f) & (convention == PAPER ? 0 : -1); /* all bits: of vectors only the first counts */
    *bare = SELECTW(none, 1.0f, one_minus_exp(-gamma * log_c, hidden));
    return SELECTW(none, 0.0f, hidden);
}

/* Tilts normals, by the coverage, against the part of a slope that lies in the surface. The slope is clamped smoothly, under
 * 1 / sqrt(flatness2): a bump that is steeper than the view upon it hides its far side. */
static inline void tilt(
    __global float *normal, const int plane, const floatw covered, const floatw sx, const floatw sy, const floatw sz,
    const floatw flatness2)
{
    const floatw nx = LOADW(normal), ny = LOADW(normal + plane), nz = LOADW(normal + 2 * plane);
    const floatw off = fma(nx, sx, fma(ny, sy, nz * sz));
    const floatw ax = fma(-nx, off, sx), ay = fma(-ny, off, sy), az = fma(-nz, off, sz);
    const floatw steep2 = fma(ax, ax, fma(ay, ay, az * az));
    const floatw share = covered * RSQRTW(fma(steep2, flatness2, 1.0f));
    const floatw tx = fma(-share, ax, nx), ty = fma(-share, ay, ny), tz = fma(-share, az, nz);
    const floatw inv = RSQRTW(fma(tx, tx, fma(ty, ty, tz * tz)));
    const intw white = covered > 0.0f;
    STOREW(SELECTW(white, tx * inv, nx), normal);
    STOREW(SELECTW(white, ty * inv, ny), normal + plane);
    STOREW(SELECTW(white, tz * inv, nz), normal + 2 * plane);
}

/* Which rows of the tables of frames the lanes belong to; 0 is the world. */
static inline intw rows_of(
    __global const int *restrict vehicle, __global const int *restrict vehicle_row, const int vehicle_ids)
{
    int rows[W];
    for (int lane = 0; lane < W; lane++)
        rows[lane] = vehicle[lane] < vehicle_ids ? vehicle_row[vehicle[lane]] : 0;
    return LOADW(rows);
}

__kernel void snow_cover(
    __global float *depth,
    __global float *normal,
    __global float *albedo,
    __global float *roughness,
    __global float *metallic,
    __global float *snow_coverage,
    __global float *snow_bare,
#ifdef LAYERS
    __global float *snow_height,
#endif
    __global const uchar *sky,
    __global const uchar *road,
    __global const int *vehicle,
    __global const float *restrict up,
    __global const int *restrict vehicle_row,
    const int vehicle_ids,
    __global const int *restrict vehicle_block,
    __global const float *restrict vehicle_frame,
    __global const float *restrict vehicle_kept,
    __global const float *restrict track_segment,
    __global const int *restrict track_path,
    const int track_count,
    const float fx,
    const float fy,
    const float cx,
    const float cy,
    const float depth_cm,
    const float bumps,
    const float cover_cm,
    const float gamma,
    const float up_flat,
    const float up_steep,
    const float max_slope,
    const float3 snow_albedo,
    const float snow_roughness,
    const float road_share,
    const float road_bare,
    const float track_gauge_m,
    const float track_width_m,
    const float track_share,
    const float track_middle,
    const int displacement,
    const int convention,
    const int pitch,
    const int plane)
{
    const int column = W * get_global_id(0), i = get_global_id(1) * pitch + column;
    const floatw nx = LOADW(normal + i), ny = LOADW(normal + i + plane), nz = LOADW(normal + i + 2 * plane);
    const floatw over_steep = dot_less(nx, up[0], ny, up[1], nz, up[2], up_steep);
    const float ramped = 1.0f / (up_flat - up_steep);
    const floatw open = smooth_ramp(over_steep * ramped);
    const intw above = LOADMASKW(sky + i);
    const floatw stays = SELECTW(above, 0.0f, open);
    const floatw slips = SELECTW(above, 1.0f, smooth_ramp(fma(-ramped, over_steep, 1.0f)));
    intw waiting = stays > 0.0f;
    if (!ANYW(waiting)) {
        STOREW((floatw)0.0f, snow_coverage + i);
        STOREW((floatw)1.0f, snow_bare + i);
#ifdef LAYERS
        STOREW((floatw)0.0f, snow_height + i);
#endif
        return;
    }

    const floatw z = LOADW(depth + i), du = LANES + ((float)column - cx), dv = (floatw)((float)get_global_id(1) - cy);
    const floatw px = du * z / fx, py = dv * z / fy;
    const floatw n_point = fma(nx, px, fma(ny, py, nz * z));
    const floatw grazing2 = fma(px, px, fma(py, py, z * z)) / fmax(n_point * n_point, 1e-12f);
    const floatw footprint2 = z * z * grazing2 / (fx * fx); /* squared longer side of the pixel's footprint */

    floatw height = 0.0f, sx = 0.0f, sy = 0.0f, sz = 0.0f;
    const intw rows = rows_of(vehicle + i, vehicle_row, vehicle_ids);
    while (ANYW(waiting)) {
        const int number = (int)MAXW(SELECTW(waiting, FLOATW(rows), -1.0f));
        const intw here = waiting & (rows == number);
        waiting &= rows != number;
        __global const float *frame = vehicle_frame + FRAME * number;
        const int block_x = vehicle_block[2 * number], block_z = vehicle_block[2 * number + 1];
        const Place place = places(du, dv, z, fx, fy, frame, frame + 9, frame + 18, frame + 21);
        const Snow snow = metaballs(place, block_x, block_z, footprint2, convention == PAPER);
        floatw ground = 0.01f * depth_cm * vehicle_kept[number];
        if (number == 0) {
            const intw driven = here & LOADMASKW(road + i) & (LOADW(vehicle + i) == 0);
            if (ANYW(driven)) {
                floatw octave;
                const floatw thin = patches(place, block_x, block_z, &octave);
                const floatw kept = kept_in_tracks(
                    place, WOBBLE * fma(octave, 2.0f, -1.0f), driven, track_segment, track_path, track_count,
                    track_gauge_m, track_width_m, track_share, track_middle);
                ground *= SELECTW(driven, road_share * up_to_one(1.0f - road_bare, thin) * kept, 1.0f);
            }
        }
        const floatw along_x = ground * bumps * snow.along_x, along_z = ground * bumps * snow.along_z;
        height = SELECTW(here, ground * fma(snow.height, (floatw)bumps, (floatw)(1.0f - bumps)), height);
        sx = SELECTW(here, fma(along_x, frame[0], along_z * frame[6]), sx);
        sy = SELECTW(here, fma(along_x, frame[1], along_z * frame[7]), sy);
        sz = SELECTW(here, fma(along_x, frame[2], along_z * frame[8]), sz);
    }

    floatw bare;
    const floatw covered = stays * coverage(height, cover_cm, gamma, convention, &bare);
    /* The sum is rounded; what no snow lies on keeps its bits. */
    const floatw left = SELECTW(covered == 0.0f, 1.0f, fma(stays, bare, slips));
    STOREW(covered, snow_coverage + i);
    STOREW(left, snow_bare + i);
#ifdef LAYERS
    STOREW(height * stays, snow_height + i);
#endif
    tilt(normal + i, plane, covered, sx, sy, sz, grazing2 + 1.0f / (max_slope * max_slope));

    const floatw r = LOADW(albedo + i), g = LOADW(albedo + i + plane), b = LOADW(albedo + i + 2 * plane);
    STOREW(fma(covered, snow_albedo.x, left * r), albedo + i);
    STOREW(fma(covered, snow_albedo.y, left * g), albedo + i + plane);
    STOREW(fma(covered, snow_albedo.z, left * b), albedo + i + 2 * plane);
    const floatw rough = LOADW(roughness + i), metal = LOADW(metallic + i);
    STOREW(fma(covered, snow_roughness, left * rough), roughness + i);
    STOREW(metal * left, metallic + i);
    if (displacement) {
        const floatw thick = height * stays * (over_steep + up_steep);
        STOREW(z * (1.0f - thick / fmax(fabs(n_point), fmax(4.0f * thick, 1e-12f))), depth + i);
    }
}
