/* night_grade.cl - tone and colour of the night. Mirrors reference_numpy/night_grade.py.
 * Paper, supp. "LUT Construction for Global Tone Mapping".
 *
 * The percentile is selected exactly, digit after digit: floats >= 0 are ordered as their bits, of which the first
 * stage counts the highest eleven, the next two ten each among the pixels that share the digits found so far. Only
 * integers are added, so that no order of work-groups changes the result. Work-group k counts rows k, k + groups, ...
 *
 * The sky's weight goes through the mask four times: dilated down and across, blurred down and across. What is read
 * across lies in rows with margins, which repeat the first and the last pixel.
 */
#include "include/srgb.h"
#include "include/vec.h"

#define PAPER 1          /* convention */
#define ROWS 704         /* height of the pictures for which the paper gives its pixels */
#define BINS 2048        /* of the highest digit; the others use half of them */
#define HIGH 20, 11      /* lowest bit and number of bits of each digit */
#define MIDDLE 10, 10
#define LOW 0, 10
#define RANK 0           /* grade_state: rank of the pixel among those with the digits found so far, from 1 */
#define PREFIX 1         /* the digits found so far */
#ifdef LAYERS
#define SKY_IS_WANTED 1
#else
#define SKY_IS_WANTED (sky_factor < 1.0f)
#endif

static inline int rows_of(const int height, const int convention)
{
    return convention == PAPER ? ROWS : height;
}

static inline int dilation(const int sky_dilate_px, const int rows)
{
    return (2 * sky_dilate_px * rows + ROWS) / (2 * ROWS);
}

/* Where the blur ends: 3 standard deviations. */
static inline int blur_reach(const int sky_blur_px, const int rows)
{
    return (3 * sky_blur_px * rows + ROWS - 1) / ROWS;
}

/* Room left and right of a row, enough for every reach and a vector; as `_margin` in aw4d/passes.py. */
static inline int margin_of(const int height)
{
    return (height / 64 + 8) * 16;
}

/* Offset of pixel (0, y) in a plane with margins. */
static inline int wide_row(const int y, const int height, const int pitch)
{
    const int margin = margin_of(height);
    return margin + y * (pitch + 2 * margin);
}

/* Stores a vector; the first and the last of a row also fill its margins as far as `reach`. */
#define STORE_WIDE(values, row, x, width, reach) \
    { \
        STOREW(values, row + x); \
        if (x == 0) \
            for (int k = 1; k <= reach; k++) \
                row[-k] = row[0]; \
        if (x + W >= width) \
            for (int k = 0; k < reach + W; k++) \
                row[width + k] = row[width - 1]; \
    }

#if W == 1
#define MASKW(c) ((uchar)(c)) /* a comparison as bytes of 0 and 1 */
#else
#define MASKW(c) JOIN(convert_uchar, W)((c) & 1)
#endif

/* Blank bins, the rank to find, the taps of the blur. */
__kernel void night_grade_prepare(
    __global int *grade_bins,
    __global int *grade_state,
    __global float *grade_taps,
    const int percentile,
    const int sky_blur_px,
    const int convention,
    const int width,
    const int height)
{
    for (int k = 0; k < BINS; k += 16)
        vstore16((int16)(0), 0, grade_bins + k);
    grade_state[RANK] = (int)(((long)width * height * percentile + 99) / 100);
    grade_state[PREFIX] = 0;

    const int rows = rows_of(height, convention), reach = blur_reach(sky_blur_px, rows);
    const float sigma = (float)(max(sky_blur_px, 1) * rows) / ROWS;
    float sum = 0.0f;
    for (int k = reach; k >= 0; k--) {
        grade_taps[k] = exp(-0.5f * (k / sigma) * (k / sigma));
        sum += k ? 2.0f * grade_taps[k] : grade_taps[k];
    }
    for (int k = 0; k <= reach; k++)
        grade_taps[k] /= sum;
}

/* One more in a bin, or a few. A group of a single work-item, as CPUs have them, needs no atomic, which takes as long as
 * twenty additions. */
static inline void add_to(__local int *bin, const int more)
{
    if (get_local_size(0) == 1)
        *bin += more;
    else
        atomic_add(bin, more);
}

/* Counts one digit of the luminances that have the digits found so far. */
static inline void count(
    __global const float *grade_grey,
    __local int *bins,
    __global int *grade_bins,
    const int lowest,
    const int size,
    const int prefix,
    const int width,
    const int height,
    const int pitch)
{
    const int digits = 1 << size;
    for (int k = get_local_id(0); k < digits; k += get_local_size(0))
        bins[k] = 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int y = get_group_id(1); y < height; y += get_num_groups(1))
        for (int x = W * get_local_id(0); x < width; x += W * get_local_size(0)) {
            __global const int *bits = (__global const int *)grade_grey + y * pitch + x;
            const intw sought = LOADW(bits) >> (lowest + size) == prefix;
            const int first = bits[0] >> lowest;
            if (!ANYW(sought))
                continue;
            if (x + W <= width && !ANYW(LOADW(bits) >> lowest != first))
                add_to(bins + (first & (digits - 1)), W);
            else
                for (int j = 0; j < min(W, width - x); j++)
                    if (bits[j] >> (lowest + size) == prefix)
                        add_to(bins + ((bits[j] >> lowest) & (digits - 1)), 1);
        }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int k = get_local_id(0); k < digits; k += get_local_size(0))
        if (bins[k])
            atomic_add(grade_bins + k, bins[k]);
}

/* Appends the digit whose bin holds the rank to those found, and blanks the bins. */
static inline void select_digit(__global int *grade_bins, __global int *grade_state, const int lowest, const int size)
{
    int rank = grade_state[RANK], digit = -1;
    for (int first = 0; first < 1 << size; first += 16) {
        const int8 n8 = vload8(0, grade_bins + first) + vload8(0, grade_bins + first + 8);
        const int4 n4 = n8.lo + n8.hi;
        const int total = n4.x + n4.y + n4.z + n4.w;
        if (digit < 0 && rank <= total)
            for (digit = first; rank > grade_bins[digit]; digit++)
                rank -= grade_bins[digit];
        else if (digit < 0)
            rank -= total;
        vstore16((int16)(0), 0, grade_bins + first);
    }
    grade_state[RANK] = rank;
    grade_state[PREFIX] = grade_state[PREFIX] << size | digit;
}

__kernel void night_grade_count_high(
    __global const float *rgb,
    __global float *grade_grey,
    __global int *grade_bins,
    const float luminance,
    const int width,
    const int height,
    const int pitch,
    const int plane)
{
    __local int bins[BINS];
    if (luminance >= 0.0f)
        return;
    for (int y = get_group_id(1); y < height; y += get_num_groups(1))
        for (int x = W * get_local_id(0); x < width; x += W * get_local_size(0)) {
            const int i = y * pitch + x;
            const floatw Y = luminance_of(LOADW(rgb + i), LOADW(rgb + i + plane), LOADW(rgb + i + 2 * plane));
            STOREW(fabs(Y), grade_grey + i); /* -0 would come last */
        }
    count(grade_grey, bins, grade_bins, HIGH, 0, width, height, pitch);
}

__kernel void night_grade_select_high(__global int *grade_bins, __global int *grade_state, const float luminance)
{
    if (luminance < 0.0f)
        select_digit(grade_bins, grade_state, HIGH);
}

__kernel void night_grade_count_middle(
    __global const float *grade_grey,
    __global int *grade_bins,
    __global const int *grade_state,
    const float luminance,
    const int width,
    const int height,
    const int pitch)
{
    __local int bins[BINS];
    if (luminance < 0.0f)
        count(grade_grey, bins, grade_bins, MIDDLE, grade_state[PREFIX], width, height, pitch);
}

__kernel void night_grade_select_middle(__global int *grade_bins, __global int *grade_state, const float luminance)
{
    if (luminance < 0.0f)
        select_digit(grade_bins, grade_state, MIDDLE);
}

__kernel void night_grade_count_low(
    __global const float *grade_grey,
    __global int *grade_bins,
    __global const int *grade_state,
    const float luminance,
    const int width,
    const int height,
    const int pitch)
{
    __local int bins[BINS];
    if (luminance < 0.0f)
        count(grade_grey, bins, grade_bins, LOW, grade_state[PREFIX], width, height, pitch);
}

/* The last digit, and the exposure that follows from the luminance. */
__kernel void night_grade_select_low(
    __global int *grade_bins,
    __global int *grade_state,
    __global float *grade_gain,
    const float luminance,
    const float strength)
{
    float L = luminance;
    if (luminance < 0.0f) {
        select_digit(grade_bins, grade_state, LOW);
        L = as_float(grade_state[PREFIX]);
    }
    *grade_gain = (0.98f - 0.20f * strength) * clamp(0.22f / (L + 1e-6f), 0.6f, 1.6f);
}

/* Whether there is sky up to so many rows above or below, in the rows of a strip: by how many rows ago there was, on the way
 * down and on the way up. */
__kernel void night_grade_dilate_down(
    __global const uchar *sky,
    __global uchar *grade_seen,
    const float sky_factor,
    const int sky_dilate_px,
    const int convention,
    const int width,
    const int height,
    const int pitch)
{
    if (!SKY_IS_WANTED)
        return;
    const int x = W * get_global_id(0), top = TILE * get_global_id(1), end = min(top + TILE, height);
    const int reach = dilation(sky_dilate_px, rows_of(height, convention));
    intw above[TILE], ago = reach + 1;
    for (int y = max(top - reach, 0); y < end; y++) {
        ago = select(ago + 1, (intw)0, LOADMASKW(sky + y * pitch + x));
        if (y >= top)
            above[y - top] = ago;
    }
    ago = reach + 1;
    for (int y = min(end - 1 + reach, height - 1); y >= top; y--) {
        ago = select(ago + 1, (intw)0, LOADMASKW(sky + y * pitch + x));
        if (y < end) {
            const ucharw seen = MASKW(min(ago, above[y - top]) <= reach);
            __global uchar *row = grade_seen + wide_row(y, height, pitch);
            STORE_WIDE(seen, row, x, width, reach);
        }
    }
}

__kernel void night_grade_dilate_across(
    __global const uchar *grade_seen,
    __global uchar *grade_grown,
    const float sky_factor,
    const int sky_dilate_px,
    const int convention,
    const int height,
    const int pitch)
{
    if (!SKY_IS_WANTED)
        return;
    const int x = W * get_global_id(0), y = get_global_id(1);
    const int reach = dilation(sky_dilate_px, rows_of(height, convention));
    __global const uchar *row = grade_seen + wide_row(y, height, pitch) + x;
    ucharw grown = 0;
    for (int k = -reach; k <= reach; k++)
        grown |= LOADW(row + k);
    STOREW(grown, grade_grown + y * pitch + x);
}

/* Share of the rows around W pixels of a column that are sky, or that are none; exact away from the mask's edge. */
OUT_OF_LINE floatw share_down(
    __global const uchar *column, __global const float *taps, const int reach, const int y, const int height,
    const int pitch, const int is_sky)
{
    ucharw some = LOADW(column + y * pitch), all = some;
    for (int k = max(y - reach, 0); k <= min(y + reach, height - 1); k++) {
        const ucharw here = LOADW(column + k * pitch);
        some |= here;
        all &= here;
    }
    const float sky = is_sky ? 1.0f : 0.0f;
    if (!ANYW(INTW(some != all)))
        return SELECTW(LOADMASKW(column + y * pitch), sky, 1.0f - sky);
    floatw sum = 0.0f;
    for (int k = -reach; k <= reach; k++) {
        const intw here = LOADMASKW(column + clamp(y + k, 0, height - 1) * pitch);
        sum += taps[abs(k)] * SELECTW(here, sky, 1.0f - sky);
    }
    return sum;
}

/* What is not sky is blurred, so that a darkened sky keeps its digits where next to nothing is left of it; the sky itself
 * only for the layer. */
__kernel void night_grade_blur_down(
    __global const uchar *grade_grown,
    __global const float *grade_taps,
    __global float *grade_open,
#ifdef LAYERS
    __global float *grade_wide,
#endif
    const float sky_factor,
    const int sky_blur_px,
    const int convention,
    const int width,
    const int height,
    const int pitch)
{
    if (!SKY_IS_WANTED)
        return;
    const int x = W * get_global_id(0), y = get_global_id(1);
    const int reach = blur_reach(sky_blur_px, rows_of(height, convention));
    const floatw open = share_down(grade_grown + x, grade_taps, reach, y, height, pitch, 0);
    __global float *row = grade_open + wide_row(y, height, pitch);
    STORE_WIDE(open, row, x, width, reach);
#ifdef LAYERS
    const floatw sky = share_down(grade_grown + x, grade_taps, reach, y, height, pitch, 1);
    __global float *sky_row = grade_wide + wide_row(y, height, pitch);
    STORE_WIDE(sky, sky_row, x, width, reach);
#endif
}

/* One channel: exposure, highlights, and the table's factor. */
static inline floatw grade(const floatw light, const float gain, const float factor, const int convention)
{
    const floatw lit = gain * light;
    const floatw code = srgb_encode(lit / fma(0.25f, lit, 1.0f));
    return srgb_decode(fmin(factor * (convention == PAPER ? fmin(code, 1.0f) : code), 1.0f));
}

/* Mean of a row around W pixels; of what is the same all around, that. */
OUT_OF_LINE floatw blurred(__global const float *row, __global const float *taps, const int reach)
{
    const floatw here = LOADW(row), first = *row;
    intw differs = LOADW(row + reach) != first;
    for (int k = -reach; k < reach; k += W)
        differs |= LOADW(row + k) != first;
    if (!ANYW(differs))
        return first;
    floatw sum = taps[0] * here;
    for (int k = 1; k <= reach; k++)
        sum = fma(taps[k], LOADW(row - k) + LOADW(row + k), sum);
    return sum;
}

/* The blur across, and the grade of what the blur has weighted. */
__kernel void night_grade(
    __global float *rgb,
    __global const float *grade_open,
    __global const float *grade_taps,
    __global const float *grade_gain,
#ifdef LAYERS
    __global const float *grade_wide,
    __global float *sky_weight,
#endif
    const float strength,
    const float sky_factor,
    const int sky_blur_px,
    const int convention,
    const int height,
    const int pitch,
    const int plane)
{
    const int x = W * get_global_id(0), y = get_global_id(1), i = y * pitch + x;
    floatw keep = 1.0f;
    if (SKY_IS_WANTED) {
        const int reach = blur_reach(sky_blur_px, rows_of(height, convention));
        const int from = wide_row(y, height, pitch) + x;
        const floatw open = blurred(grade_open + from, grade_taps, reach);
        keep = fma(1.0f - sky_factor, fmin(open, 1.0f), sky_factor); /* rounding may bring the sum above 1 */
#ifdef LAYERS
        STOREW(blurred(grade_wide + from, grade_taps, reach), sky_weight + i);
#endif
    }
    const float gain = *grade_gain, beta = 0.7f + 0.2f * (1.0f - strength);
    const float3 factor = beta * (float3)(0.85f - 0.15f * strength, 0.9f - 0.1f * strength, 1.05f + 0.2f * strength);
    STOREW(keep * grade(LOADW(rgb + i), gain, factor.x, convention), rgb + i);
    STOREW(keep * grade(LOADW(rgb + i + plane), gain, factor.y, convention), rgb + i + plane);
    STOREW(keep * grade(LOADW(rgb + i + 2 * plane), gain, factor.z, convention), rgb + i + 2 * plane);
}
