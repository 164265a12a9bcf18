/* sort.h - a stable sort of numbers by a key of 16 bits, by two digits: NumPy's argsort. Every digit is counted in chunks,
 * the counts are summed up, and the numbers are spread by them. None of it waits for the host.
 *
 * Given at build time: CHUNKS of what is sorted that are counted together, DIGITS of a digit.
 */
#ifndef SORT_H
#define SORT_H

/* Where one of `shares` of n things begins. */
static inline int share_begin(const int n, const int share, const int shares)
{
    return n / shares * share + min(share, n % shares);
}

static inline int chunk_begin(const int n, const int chunk)
{
    return share_begin(n, chunk, CHUNKS);
}

static inline int place_of(const uint key, const int shift, const int chunk)
{
    return (key >> shift & (DIGITS - 1)) * CHUNKS + chunk;
}

static inline void clear_counts(const int chunk, __global int *counts)
{
    for (int d = 0; d < DIGITS; d++)
        counts[d * CHUNKS + chunk] = 0;
}

/* Counts a digit of the keys of some numbers of a chunk. */
static inline void count_digit(
    __global const uint *key, __global const uint *numbers, const int from, const int to, const int shift,
    const int chunk, __global int *counts)
{
    for (int j = from; j < to; j++)
        counts[place_of(key[numbers[j]], shift, chunk)]++;
}

/* Turns counts into the places where each chunk's numbers of each digit begin, and gives their sum. */
static inline int sum_counts(__global int *counts)
{
    int sum = 0;
    for (int k = 0; k < DIGITS * CHUNKS; k++) {
        const int here = counts[k];
        counts[k] = sum;
        sum += here;
    }
    return sum;
}

/* Puts some numbers of a chunk in the order of a digit. */
static inline void spread_digit(
    __global const uint *key, __global const uint *numbers, const int from, const int to, const int shift,
    const int chunk, __global int *counts, __global uint *sorted)
{
    for (int j = from; j < to; j++)
        sorted[counts[place_of(key[numbers[j]], shift, chunk)]++] = numbers[j];
}
#endif
