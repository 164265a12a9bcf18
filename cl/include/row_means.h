/* row_means.h - means over blocks of rows. Mirrors reference_numpy/row_means.py. */
#ifndef ROW_MEANS_H
#define ROW_MEANS_H
#include "vec.h"

#define BLOCKS 3
#define LARGEST_BLOCK 27
#define LEAST_MEAN 1e-6f  /* share of things below which a mean is of none */
__constant int BLOCK_ROWS[BLOCKS] = {3, 9, LARGEST_BLOCK};

/* How many blocks of so many rows there are. */
static inline int blocks_of(const int rows, const int height)
{
    return (height + rows - 1) / rows;
}

/* Where the means of a size of blocks begin: red, green, blue and the share of things, a plane each. */
static inline int first_mean(const int block, const int height, const int row)
{
    int first = 0;
    for (int i = 0; i < block; i++)
        first += 4 * row * blocks_of(BLOCK_ROWS[i], height);
    return first;
}

/* The two blocks that a stretch of rows lies between. */
typedef struct {
    int above, below;            /* where their rows of red begin */
    int size;                    /* from there to green, blue and share */
    float lower;                 /* weight of the one below */
} Means;

/* Of blocks of one size, a number that is known when this is compiled: dividing by others takes long. */
static inline Means means_in(const int block, const int y, const int step, const int height, const int row)
{
    const int rows = BLOCK_ROWS[block], count = blocks_of(rows, height), first = first_mean(block, height, row);
    const int middle = 2 * y + step + rows, above = middle / (2 * rows) - 1;
    Means m;
    m.above = first + max(above, 0) * row;
    m.below = first + min(above + 1, count - 1) * row;
    m.size = count * row;
    m.lower = (middle % (2 * rows)) / (2.0f * rows);
    return m;
}

/* For the rows from y on, as many as a step passes. */
static inline Means means_around(const int y, const int step, const int height, const int row)
{
    if (step <= BLOCK_ROWS[0])
        return means_in(0, y, step, height, row);
    if (step <= BLOCK_ROWS[1])
        return means_in(1, y, step, height, row);
    return means_in(2, y, step, height, row);
}
#endif
