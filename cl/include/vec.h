/* vec.h - vectors of W pixels: one name for float and int at width 1 (GPU), 4, 8 and 16 (AVX2, AVX-512).
 *
 * W is given at build time. Planes are planar and every row is padded to a multiple of W, so lane j of a vector is the
 * pixel j to the right of its first one. Comparisons of vectors give all bits set, of scalars 1; select() takes both.
 */
#ifndef W
#error "W, the vector width, must be 1, 4, 8 or 16"
#endif

#if W == 1
typedef float floatw;
typedef int intw;
#define LOADW(p) (*(p))
#define STOREW(x, p) (*(p) = (x))
#define LOADMASKW(p) ((int)(*(p) != 0))
#define LANES 0.0f
#define as_floatw as_float
#define as_intw as_int
#define ANYW(c) (c)
#else
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
typedef JOIN(float, W) floatw;
typedef JOIN(int, W) intw;
#define LOADW(p) JOIN(vload, W)(0, p)
#define STOREW(x, p) JOIN(vstore, W)(x, 0, p)
#define LOADMASKW(p) (JOIN(convert_int, W)(JOIN(vload, W)(0, p)) != 0)
#define ANYW(c) any(c)
#define as_floatw JOIN(as_float, W)
#define as_intw JOIN(as_int, W)
#if W == 4
#define LANES ((floatw)(0, 1, 2, 3))
#elif W == 8
#define LANES ((floatw)(0, 1, 2, 3, 4, 5, 6, 7))
#else
#define LANES ((floatw)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15))
#endif
#endif

/* floatw: yes where c holds, else no; scalars are spread over the lanes */
#define SELECTW(c, yes, no) select((floatw)(no), (floatw)(yes), c)
