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
typedef uint uintw;
typedef uchar ucharw;
#define LOADW(p) (*(p))
#define STOREW(x, p) (*(p) = (x))
#define LOADMASKW(p) ((int)(*(p) != 0))
#define LANES 0.0f
#define as_floatw as_float
#define as_intw as_int
#define as_uintw as_uint
#define FLOATW(x) ((float)(x))
#define ANYW(c) (c)
#define INTW(x) ((int)(x))
#define MINW(x) (x)
#define MAXW(x) (x)
#define SUMW(x) (x)
#else
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
typedef JOIN(float, W) floatw;
typedef JOIN(int, W) intw;
typedef JOIN(uint, W) uintw;
typedef JOIN(uchar, W) ucharw;
/* Kernels are written in vectors. A compiler that looks for more of them, across work-items, as Intel's does, finds none
 * and spends most of its time on it. */
#define __kernel __kernel __attribute__((vec_type_hint(floatw)))
#define LOADW(p) JOIN(vload, W)(0, p)
#define STOREW(x, p) JOIN(vstore, W)(x, 0, p)
#define LOADMASKW(p) (JOIN(convert_int, W)(JOIN(vload, W)(0, p)) != 0)
#define ANYW(c) JOIN(some, W)(c)
#define INTW(x) JOIN(convert_int, W)(x)
#define as_floatw JOIN(as_float, W)
#define as_intw JOIN(as_int, W)
#define as_uintw JOIN(as_uint, W)
#define FLOATW(x) JOIN(convert_float, W)(x)
#define MINW(x) JOIN(min, W)(x)
#define MAXW(x) JOIN(max, W)(x)
#define SUMW(x) JOIN(sum, W)(x)
#define REDUCED(name, f) \
    static inline float JOIN(name, 4)(const float4 x) { const float2 y = f(x.lo, x.hi); return f(y.x, y.y); } \
    static inline float JOIN(name, 8)(const float8 x) { return JOIN(name, 4)(f(x.lo, x.hi)); } \
    static inline float JOIN(name, 16)(const float16 x) \
    { \
        float v[16]; /* stays in registers; of the halves of a float16 Oclgrind 21.10 takes the upper lanes for unset */ \
        vstore16(x, 0, v); \
        return JOIN(name, 8)(f(vload8(0, v), vload8(1, v))); \
    }
#define PLUS(a, b) ((a) + (b))
REDUCED(min, fmin)
REDUCED(max, fmax)
REDUCED(sum, PLUS)
/* of comparisons: their bytes take one test, where any() takes the lanes one after the other */
static inline int some4(const int4 c) { return as_uint(convert_char4(c)) != 0; }
static inline int some8(const int8 c) { return as_ulong(convert_char8(c)) != 0; }
static inline int some16(const int16 c) { const ulong2 b = as_ulong2(convert_char16(c)); return (b.x | b.y) != 0; }
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

/* 1 / sqrt(x) for x >= 0, finite at 0, within 1.7 x 2^-24. By a guess from the exponent's bits and one step of fourth order
 * (coefficients: minimax over the guess' error): CPUs divide and take roots ten times more slowly than they multiply. */
#if W == 1
#define RSQRTW(x) rsqrt(fmax(x, 1e-36f))
#else
static inline floatw rsqrt_by_steps(const floatw x)
{
    const floatw y = as_floatw(0x5f374800 - (as_intw(x) >> 1));
    const floatw e = fma(-x * y, y, 1.0f);
    const floatw odd = fma(e, 0.37499781f, 0.49999835f), even = fma(e, 0.27491372f, 0.31393055f);
    return fma(y * e, fma(e * e, even, odd), y);
}
#define RSQRTW(x) rsqrt_by_steps(x)
#endif

/* Asks for what a work-item of the same row reads, or changes, AHEAD pixels on. Processors find out by themselves what is read
 * next, but anew on every page of memory, and of a dozen planes side by side late. GPUs hide the wait. */
#define AHEAD 512 /* a multiple of TILE */
#if W > 1 && defined(__has_builtin) && !defined(NO_FETCH)
#if __has_builtin(__builtin_prefetch)
#define FETCH_AT(p) __builtin_prefetch((const void *)(uintptr_t)(p))
#define FETCH_TO_CHANGE(p) __builtin_prefetch((const void *)(uintptr_t)((p) + AHEAD), 1)
#endif
#endif
#ifndef FETCH_AT
#define FETCH_AT(p)
#define FETCH_TO_CHANGE(p)
#endif
#define FETCH(p) FETCH_AT((p) + AHEAD)
#define FETCH3(p, plane) do { FETCH(p); FETCH((p) + plane); FETCH((p) + 2 * plane); } while (0)
#define FETCH3_TO_CHANGE(p, plane) \
    do { FETCH_TO_CHANGE(p); FETCH_TO_CHANGE((p) + plane); FETCH_TO_CHANGE((p) + 2 * plane); } while (0)

/* For what is to be part of its callers: PoCL leaves out of line what is long and has several. */
#ifdef NO_INLINE
#define INLINE static inline
#else
#define INLINE __attribute__((always_inline)) static inline
#endif

/* For functions with loops: what a kernel holds across one PoCL keeps in memory for every work-item of a group apart, more
 * than the cache; what a function holds is on the stack. */
#if W == 1
#define OUT_OF_LINE static inline
#else
#define OUT_OF_LINE __attribute__((noinline)) static
#endif
