/* clothsim.h - finite-element cloth for C programs, in one header.             version 0.1.0
 * SPDX-License-Identifier: MIT
 *
 * Triangle meshes with a flat rest shape, St.Venant-Kirchhoff stretch, hinge bending, implicit
 * time steps solved as a minimisation. C99, libc and libm only. No globals, no printing, no exit.
 *
 * In ONE .c file:        #define CLOTHSIM_IMPLEMENTATION
 *                        #include "clothsim.h"
 * everywhere else:       #include "clothsim.h"
 * compile:               cc -std=c99 -O2 -ffp-contract=off my.c -lm
 *
 * CONTENTS
 *   read before the first line of your own
 *     [1.1] QUICK START                      [1.2] WHAT IT DOES NOT DO
 *     [1.3] CONVENTIONS                      [1.4] CONFIGURATION
 *     [1.5] REFERENCES
 *   the interface
 *     [2.1] VERSION AND DEFAULTS             [2.2] STATUS AND HOOKS
 *     [2.3] TYPES                            [2.4] EVERYDAY (tier 1)
 *     [2.5] CONTROL (tier 2)                 [2.6] BUILDING BLOCKS (tier 3)
 *   the implementation, bottom-up: each section is a lesson
 *     [3.1] SMALL MATHS                      [3.2] MEMORY, TEXT, RANGES
 *     [4.1] MESH CHECK                       [4.2] TOPOLOGY
 *     [4.3] GENERATORS                       [4.4] REST SHAPE
 *     [4.5] OBJ FILES
 *     [5.1] MATERIALS
 *     [6.1] SPRING                           [6.2] STVK TRIANGLE
 *     [6.3] HINGE                            [6.4] QUADRATIC BENDING
 *     [6.5] EIGHT ELEMENTS AT A TIME
 *     [7.1] ORDERING                         [7.2] BLOCK SPARSE MATRIX
 *     [7.3] CONJUGATE GRADIENTS              [7.4] SPARSE CHOLESKY
 *     [8.1] MODEL                            [8.2] SIM
 *     [9.1] ENERGY TERMS                     [9.2] NEWTON
 *     [9.3] IMPLICIT STEPS AND STATICS       [9.4] LEAPFROG
 *     [9.5] THE STEP
 *     [10.1] RUN-TIME CONTROL                [10.2] SNAPSHOT
 *     [10.3] QUERIES                         [10.4] ADVICE
 *     [11.1] CHANGES AND LICENCE
 */

/* ===== [1.1] QUICK START ===================================================================== */
/* ===== [1.2] WHAT IT DOES NOT DO ============================================================= */
/* ===== [1.3] CONVENTIONS ===================================================================== */
/* ===== [1.4] CONFIGURATION =================================================================== */
/* ===== [1.5] REFERENCES ====================================================================== */
/*
 * [BERGOU]  Bergou, Wardetzky, Harmon, Zorin, Grinspun, A quadratic bending model for inextensible
 *           surfaces, SGP 2006, 227-230.
 * [DRAPE22] Learning-based bending stiffness parameter estimation by a drape tester, ACM Trans.
 *           Graph. 41(6) 2022; its data set, repository DrapeTester/ClothDrapeTester.
 * [DS]      Grinspun, Hirani, Desbrun, Schroeder, Discrete shells, SCA 2003, 62-67.
 * [StVK]    Bonet, Wood, Nonlinear continuum mechanics for finite element analysis, Cambridge 2008,
 *           section 6.4 (St.Venant-Kirchhoff material).
 * [WOR11]   Wang, O'Brien, Ramamoorthi, Data-driven elastic models for cloth: modeling and
 *           measurement, ACM Trans. Graph. 30(4) 2011, doi 10.1145/2010324.1964966.
 */

#ifndef CLOTHSIM_H
#define CLOTHSIM_H

#include <stddef.h>
#include <stdint.h>

/* ===== [2.1] VERSION AND DEFAULTS ============================================================ */

#define CLOTH_VERSION_MAJOR 0
#define CLOTH_VERSION_MINOR 1
#define CLOTH_VERSION_PATCH 0
#define CLOTH_VERSION_NUM \
    (10000 * CLOTH_VERSION_MAJOR + 100 * CLOTH_VERSION_MINOR + CLOTH_VERSION_PATCH)

#if defined(__FAST_MATH__) && !defined(CLOTH_ALLOW_FAST_MATH)
#error "clothsim.h needs IEEE arithmetic: compile this file without -ffast-math"
#endif

/* @@ CLOTH_API: linkage of every public function (all files). */
#ifndef CLOTH_API
#  ifdef CLOTHSIM_STATIC
#    if defined(__GNUC__)
#      define CLOTH_API static __attribute__((unused))
#    else
#      define CLOTH_API static
#    endif
#  else
#    define CLOTH_API extern
#  endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.2] STATUS AND HOOKS ================================================================ */

/* One list makes the enum and cloth_status_text(): they cannot drift apart.
 * Values are written out and never reused. */
#define CLOTH_STATUS_LIST(X)                                                                     \
    X(CLOTH_OK,               0, "ok")                                                           \
    X(CLOTH_ERR_ARGUMENT,    -1, "an argument is NULL or out of range")                          \
    X(CLOTH_ERR_UNINIT,      -2, "the desc was not made by its _default() function")             \
    X(CLOTH_ERR_MEMORY,      -3, "the allocator returned NULL")                                  \
    X(CLOTH_ERR_CAPACITY,    -4, "a fixed capacity is too small")                                \
    X(CLOTH_ERR_MESH,        -5, "the mesh cannot be simulated")                                 \
    X(CLOTH_ERR_PARSE,       -6, "the text is not a readable OBJ file")                          \
    X(CLOTH_ERR_IO,          -7, "a file could not be opened, read or written")                  \
    X(CLOTH_ERR_UNSUPPORTED, -8, "this choice is not built in")                                  \
    X(CLOTH_ERR_NONFINITE,   -9, "a number is NaN or infinite")                                  \
    X(CLOTH_ERR_STEP,       -10, "the step could not be completed; the state is as before")      \
    X(CLOTH_ERR_CANCELLED,  -11, "the cancel hook asked to stop; the state is as before")        \
    X(CLOTH_ERR_FORMAT,     -12, "the snapshot does not belong to this model or is damaged")     \
    X(CLOTH_ERR_HANDLE,     -13, "the handle is stale or empty")                                 \
    X(CLOTH_ERR_NUMERIC,    -14, "a matrix is singular or indefinite where it must not be")

typedef enum cloth_status {
#define CLOTH_X(name, value, text) name = value,
    CLOTH_STATUS_LIST(CLOTH_X)
#undef CLOTH_X
    CLOTH_STATUS_FORCE_INT = 0x7fffffff
} cloth_status;

/* The sentence for a status. Never NULL. */
CLOTH_API const char *cloth_status_text(cloth_status status);

typedef struct cloth_allocator {            /* both set, or both NULL: malloc and free         */
    void *(*alloc)(size_t size, void *user);            /* aligned as malloc aligns            */
    void  (*free)(void *ptr, size_t size, void *user);
    void  *user;
} cloth_allocator;

typedef enum cloth_log_level {
    CLOTH_LOG_ERROR = 1, CLOTH_LOG_WARNING = 2, CLOTH_LOG_INFO = 3
} cloth_log_level;

typedef struct cloth_log {                  /* fn == NULL: silent                              */
    void (*fn)(cloth_log_level level, cloth_status status, const char *text, void *user);
    void  *user;
} cloth_log;

/* A range of a loop: items [begin, end); worker in [0, max_workers) selects scratch only. */
typedef void cloth_range_fn(int begin, int end, int worker, void *ctx);

/* run() calls fn on disjoint ranges that cover [0, count), in any order and of any sizes, and
 * returns when all are done. Results do not depend on the ranges, the order or the workers. */
typedef struct cloth_parallel {             /* run == NULL: serial                             */
    void (*run)(void *user, int count, int grain, cloth_range_fn *fn, void *ctx);
    void  *user;
    int    max_workers;
} cloth_parallel;

typedef struct cloth_clock {                /* fn == NULL: every time in a report is 0         */
    double (*fn)(void *user);               /* s, from any origin                              */
    void    *user;
} cloth_clock;

typedef struct cloth_cancel {               /* asked once per Newton iteration and substep     */
    int  (*fn)(void *user);                 /* nonzero: give the step up                       */
    void  *user;
} cloth_cancel;

/* One struct in every desc; mesh and OBJ calls take it by pointer (NULL: malloc, silent). */
typedef struct cloth_hooks {
    cloth_allocator allocator;
    cloth_log       log;
    cloth_parallel  parallel;
    cloth_clock     clock;
    cloth_cancel    cancel;
} cloth_hooks;

/* ===== [2.3] TYPES =========================================================================== */

/* --- materials (section 5.1) --- */

typedef enum cloth_plane {
    CLOTH_PLANE_STRESS = 0,                 /* lambda = Y nu/(1-nu^2): a sheet with free faces   */
    CLOTH_PLANE_STRAIN_3D = 1               /* lambda = Y nu/((1+nu)(1-2nu)): named, not default */
} cloth_plane;

/* SI units. cloth_material_default() sets every field. */
typedef struct cloth_material {
    double      density;                    /* kg/m^2, > 0                                       */
    double      young;                      /* Pa, >= 0                                          */
    double      thickness;                  /* m, >= 0                                           */
    double      membrane;                   /* N/m, used instead of young*thickness when > 0     */
    double      poisson;                    /* (-1, 0.5], below 0.5 for CLOTH_PLANE_STRAIN_3D    */
    double      bending;                    /* N m, plate rigidity D; < 0: from Y, h and nu      */
    double      damping;                    /* s, >= 0: stress of the strain rate over elastic   */
    cloth_plane plane;
} cloth_material;

typedef enum cloth_fabric {
    CLOTH_FABRIC_COTTON_KNIT = 0, CLOTH_FABRIC_DENIM = 1, CLOTH_FABRIC_POLYESTER = 2,
    CLOTH_FABRIC_TWILL = 3, CLOTH_FABRIC_SILK = 4, CLOTH_FABRIC_WOOL = 5
} cloth_fabric;

/* ===== [2.4] EVERYDAY (tier 1) =============================================================== */

/* CLOTH_VERSION_NUM of the compiled implementation; compare with the macro of your header. */
CLOTH_API int cloth_version(void);

/* ===== [2.5] CONTROL (tier 2) ================================================================ */

/* --- materials (section 5.1) ---
 * contract: alloc none | cost O(1) | threads: any */

CLOTH_API cloth_material cloth_material_default(void);

/* A measured fabric, made isotropic; section 5.1 says where each number comes from. An unknown
 * value gives the default. */
CLOTH_API cloth_material cloth_material_fabric(cloth_fabric fabric);

/* The convention of a published cloth simulator (strain F'F - I without the 1/2, the 3D lambda,
 * Y = 1e5 taken as N/m, nu = 0.42, k_bend = 1e-6), in this kit's units. */
CLOTH_API cloth_material cloth_material_li2021(void);

/* mu and lambda of the triangle, N/m. */
CLOTH_API void cloth_material_lame(const cloth_material *m, double *mu, double *lambda);

/* The plate rigidity D, N m: m->bending, or Y h^3/(12 (1-nu^2)) when that is negative. */
CLOTH_API double cloth_material_rigidity(const cloth_material *m);

/* CLOTH_OK, CLOTH_ERR_NONFINITE or CLOTH_ERR_ARGUMENT, logged as 'material[region].field = value'.
 * hooks may be NULL. */
CLOTH_API cloth_status cloth_material_check(const cloth_hooks *hooks, const cloth_material *m,
                                            int region);

/* ===== [2.6] BUILDING BLOCKS (tier 3) ======================================================== */

/* --- elements: one at a time, plain arrays (sections 6.1 to 6.4) ---
 * Shapes and units stand on each line. An output that is not wanted is NULL. Derivatives are exact
 * for psd == 0; psd != 0 asks for a positive semidefinite Hessian (the gradient does not change).
 * Hessians are full, symmetric and row-major. Finite in, finite out: an energy beyond the range of
 * doubles is returned as the largest double, a derivative array with such an entry is all zero.
 * contract: alloc none | cost O(1) | writes grad, hess | threads: any */

/* Spring, x [2x3] m, k N/m: J = k/2 (|x1-x0| - rest_length)^2. grad [6] N, hess [6x6] N/m. [6.1] */
CLOTH_API double cloth_spring(const double *x, double rest_length, double k, double *grad,
                              double *hess, int psd);

/* Triangle, x [3x3] m, X [3x2] flat rest corners m, mu and lambda N/m. grad [9] N, hess [9x9] N/m.
 * A rest triangle without area has no energy. psd asks for mu >= 0, mu + lambda >= 0.      [6.2] */
CLOTH_API double cloth_stretch(const double *x, const double *X, double mu, double lambda,
                               double *grad, double *hess, int psd);

/* What the triangle's energy is made of: F [3x2] deformation gradient, E [2x2] Green strain,
 * S [2x2] second Piola-Kirchhoff stress N/m, stretch[2] principal stretches, large one first.
 * Returns the rest area m^2; 0 and zeros when the rest triangle has none.                  [6.2] */
CLOTH_API double cloth_stretch_state(const double *x, const double *X, double mu, double lambda,
                                     double *F, double *E, double *S, double *stretch);

/* Hinge, x [4x3] m: edge ends x0 x1, then the corner left and right of the directed edge x0->x1 as
 * seen from the side that the normals point to; c N m, angles rad. Returns c/2 (theta-theta0)^2 J,
 * the difference not wrapped. grad [12] N, hess [12x12] N/m; psd: Gauss-Newton.            [6.3] */
CLOTH_API double cloth_bend(const double *x, double c, double theta0, double *grad, double *hess,
                            int psd);

/* theta of that hinge, in [-pi, pi]: 0 when flat, positive when convex seen from the side that the
 * normals point to; 0 when a triangle has collapsed.                                       [6.3] */
CLOTH_API double cloth_dihedral(const double *x);

/* theta with its gradient [12] rad/m, and with its Hessian [12x12] rad/m^2. Return theta.  [6.3] */
CLOTH_API double cloth_dihedral_grad(const double *x, double *grad);
CLOTH_API double cloth_dihedral_hess(const double *x, double *grad, double *hess);

/* c = D e2 / (A1 + A2), N m: D N m plate rigidity, e2 m^2 squared rest length of the edge, A1 and
 * A2 m^2 rest areas. 0 when the areas are.                                                 [6.3] */
CLOTH_API double cloth_hinge_coefficient(double D, double e2, double A1, double A2);

/* Hinge without an angle, x [4x3] m as for cloth_bend: J = c/2 |sum_i w_i x_i|^2, w [4] 1/m, c N m.
 * grad [12] N, hess [12x12] N/m: constant and positive semidefinite. For flat rest shapes. [6.4] */
CLOTH_API double cloth_bend_quadratic(const double *x, const double *w, double c, double *grad,
                                      double *hess);

/* w [4] of the hinge at rest, x_rest [4x3] m, unfolded flat whatever its angle; zeros when a
 * triangle has no area.                                                                    [6.4] */
CLOTH_API void cloth_bend_quadratic_weights(const double *x_rest, double *w);

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_IMPLEMENTED)
#define CLOTHSIM_IMPLEMENTED

#include <math.h>
#include <stdarg.h>
#include <string.h>
#ifndef CLOTH_MALLOC
#  include <stdlib.h>
#  define CLOTH_MALLOC(size) malloc(size)
#  define CLOTH_FREE(ptr)    free(ptr)
#endif
/* @@ CLOTH_NO_SIMD: plain C only (implementation file). */
#if !defined(CLOTH_NO_SIMD) && defined(__AVX__)
#  include <immintrin.h>
#  define CLOTHI_AVX 1
#elif !defined(CLOTH_NO_SIMD) && defined(__SSE2__)
#  include <emmintrin.h>
#  define CLOTHI_SSE2 1
#endif
#ifndef CLOTH_ASSERT
#  include <assert.h>
#  define CLOTH_ASSERT(cond) assert(cond)
#endif

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#  define CLOTHI_RESTRICT __restrict
#  define CLOTHI_UNUSED   __attribute__((unused))
#else
#  define CLOTHI_RESTRICT
#  define CLOTHI_UNUSED
#endif

/* ===== [3.1] SMALL MATHS ===================================================================== */

/* Finite by the exponent's bits: a host's fast-math cannot remove the test. */
CLOTHI_UNUSED static int clothi_finite(double a) {
    uint64_t bits;
    memcpy(&bits, &a, sizeof bits);
    return ((bits >> 52) & 0x7ffu) != 0x7ffu;
}

/* Index of the first entry of a [n] that is NaN or infinite, -1 when there is none. */
CLOTHI_UNUSED static ptrdiff_t clothi_find_nonfinite(const double *a, size_t n) {
    size_t i;
    for (i = 0; i < n; i++)
        if (!clothi_finite(a[i])) return (ptrdiff_t)i;
    return -1;
}

CLOTHI_UNUSED static double clothi_dot3(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

CLOTHI_UNUSED static void clothi_sub3(const double *a, const double *b, double *out) {
    out[0] = a[0] - b[0];
    out[1] = a[1] - b[1];
    out[2] = a[2] - b[2];
}

CLOTHI_UNUSED static void clothi_cross3(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

CLOTHI_UNUSED static double clothi_max(double a, double b) { return a > b ? a : b; }
CLOTHI_UNUSED static double clothi_min(double a, double b) { return a < b ? a : b; }

/* What an energy beyond the range of doubles is answered with: the largest double. */
#define CLOTHI_HUGE 1.7976931348623157e308

/* An element's promise, finite out: zeroes a [n] when an entry is not finite. NULL is allowed. */
CLOTHI_UNUSED static void clothi_settle(double *a, size_t n) {
    if (a && clothi_find_nonfinite(a, n) >= 0) memset(a, 0, n * sizeof *a);
}

/* atan2 without a branch or a table, so that a loop over it becomes vector code; scalar and vector
 * callers get the same bits. (+-0, +-0) gives +-0; the sign is that of y. Digits are
 * lost when both are below 1e-284.
 *
 *   z = min(|x|,|y|) / max(|x|,|y|) in [0, 1]; beyond tan(pi/8) the angle is measured from pi/4:
 *   atan z = pi/4 + atan((z-1)/(z+1)), so that one division yields w with |w| <= tan(pi/8), and
 *   atan w = w + w t P(t), t = w^2, P of degree 10 interpolating (atan(w)/w - 1)/t at the
 *   Chebyshev nodes of [0, tan^2(pi/8)]: 7e-18 from it, a fifteenth of half an ulp.
 *   The octants put the pieces together: theta = k pi/4 +- atan w, k = 0..4, with pi/4 in two
 *   parts. Error below 3 ulp (tests/test_math.c: atan2_ulp), relative also for tiny angles. */
CLOTHI_UNUSED static inline double clothi_atan2(double y, double x) {
    const double ax = fabs(x), ay = fabs(y);
    const double big = ax > ay ? ax : ay, small = ax > ay ? ay : ax;
    /* 0 or 1 by copysign: a constant in one arm of a ?: makes gcc build a branch for it */
    const double turned = 0.5 - copysign(0.5, 0.41421356237309503 * big - small);
    const double steep = 0.5 - copysign(0.5, ax - ay), left = 0.5 - copysign(0.5, x + 0.0);
    const double den = big + turned * small;
    const double w = (small - turned * big) / (den + 1e-300), t = w * w, t2 = t * t;
    const double odd = -0.3333333333333333 + t2 * (-0.14285714284665682
        + t2 * (-0.0909090457530649 + t2 * (-0.06664510525508936
        + t2 * (-0.050854078345894844 + t2 * -0.019175404711104935))));
    const double even = 0.19999999999995516 + t2 * (0.11111111015187018
        + t2 * (0.07692183125376892 + t2 * (0.05858140904866328 + t2 * 0.03923044778479309)));
    const double a = w + w * (t * (odd + t * even));
    const double k1 = turned + steep * (2.0 - 2.0 * turned);        /* pi/2 - angle */
    const double k2 = k1 + left * (4.0 - 2.0 * k1);                 /* pi - angle */
    const double sign = (1.0 - 2.0 * steep) * (1.0 - 2.0 * left);
    return copysign(k2 * 0.7853981633974483 + (sign * a + k2 * 3.061616997868383e-17), y);
}

/* ===== [3.2] MEMORY, TEXT, RANGES ============================================================ */

/* Every block starts with a header that remembers its size (the free hook wants it) and is
 * aligned to 64 bytes, a cache line and the widest vector register in use. */
#define CLOTHI_ALIGN 64u

typedef struct clothi_block_header {
    void  *base;                            /* what the hook returned                          */
    size_t size;                            /* bytes asked of the hook                         */
} clothi_block_header;

/* count * size bytes, zeroed; NULL when the hook fails or the product overflows. hooks may be
 * NULL. count 0 gives a valid block. */
CLOTHI_UNUSED static void *clothi_alloc(const cloth_hooks *hooks, size_t count, size_t size) {
    const size_t extra = CLOTHI_ALIGN + sizeof(clothi_block_header);
    clothi_block_header header;
    unsigned char *base, *data;
    if (size != 0 && count > ((size_t)-1 - extra) / size) return NULL;
    header.size = count * size + extra;
    header.base = hooks && hooks->allocator.alloc
                      ? hooks->allocator.alloc(header.size, hooks->allocator.user)
                      : CLOTH_MALLOC(header.size);
    if (!header.base) return NULL;
    base = (unsigned char *)header.base;
    data = base + sizeof header;
    data += CLOTHI_ALIGN - 1u - ((uintptr_t)data + CLOTHI_ALIGN - 1u) % CLOTHI_ALIGN;
    memcpy(data - sizeof header, &header, sizeof header);
    memset(data, 0, count * size);
    return data;
}

/* Frees what clothi_alloc returned; NULL is allowed. */
CLOTHI_UNUSED static void clothi_free(const cloth_hooks *hooks, const void *ptr) {
    clothi_block_header header;
    if (!ptr) return;
    memcpy(&header, (const unsigned char *)ptr - sizeof header, sizeof header);
    if (hooks && hooks->allocator.free)
        hooks->allocator.free(header.base, header.size, hooks->allocator.user);
    else
        CLOTH_FREE(header.base);
}

/* Bytes that the block of clothi_alloc holds from the hook; 0 for NULL. */
CLOTHI_UNUSED static size_t clothi_block_size(const void *ptr) {
    clothi_block_header header;
    if (!ptr) return 0;
    memcpy(&header, (const unsigned char *)ptr - sizeof header, sizeof header);
    return header.size;
}

/* Text for the logger. No printf: its output depends on the locale and the host may lack it. */
typedef struct clothi_text {
    char buf[256];
    int  n;
} clothi_text;

static void clothi_text_char(clothi_text *t, char c) {
    if (t->n < (int)sizeof t->buf - 1) t->buf[t->n++] = c;
    t->buf[t->n] = '\0';
}

static void clothi_text_string(clothi_text *t, const char *s) {
    while (s && *s) clothi_text_char(t, *s++);
}

static void clothi_text_uint(clothi_text *t, uint64_t u) {
    char digits[24];
    int  n = 0;
    do {
        digits[n++] = (char)('0' + (int)(u % 10u));
        u /= 10u;
    } while (u);
    while (n) clothi_text_char(t, digits[--n]);
}

static void clothi_text_int(clothi_text *t, long long i) {
    if (i < 0) clothi_text_char(t, '-');
    clothi_text_uint(t, i < 0 ? (uint64_t)0 - (uint64_t)i : (uint64_t)i);
}

/* Six significant digits: enough for a person to recognise the number. */
static void clothi_text_double(clothi_text *t, double a) {
    int      e10, i;
    uint64_t digits;
    if (!clothi_finite(a)) {
        clothi_text_string(t, a != a ? "NaN" : a > 0 ? "inf" : "-inf");
        return;
    }
    if (a < 0) clothi_text_char(t, '-');
    a = a < 0 ? -a : a;
    if (!(a > 0)) {
        clothi_text_char(t, '0');
        return;
    }
    e10 = (int)floor(log10(a));
    i = 5 - e10;                            /* in two factors: 10^i alone may overflow         */
    digits = (uint64_t)(a * pow(10.0, i / 2) * pow(10.0, i - i / 2) + 0.5);
    if (digits >= 1000000u) {
        digits /= 10u;
        e10++;
    }
    if (e10 >= -4 && e10 < 6) {                         /* 0.00012 .. 999999 */
        uint64_t scale = 1;
        int      places = 5 - e10;
        while (places > 0 && digits % 10u == 0) {
            digits /= 10u;
            places--;
        }
        for (i = 0; i < places; i++) scale *= 10u;
        clothi_text_uint(t, digits / scale);
        if (places > 0) clothi_text_char(t, '.');
        for (i = 0; i < places; i++) {
            scale /= 10u;
            clothi_text_char(t, (char)('0' + (int)(digits / scale % 10u)));
        }
    } else {
        uint64_t scale = 100000u;
        while (digits % 10u == 0 && scale > 1) {
            digits /= 10u;
            scale /= 10u;
        }
        clothi_text_uint(t, digits / scale);
        if (scale > 1) clothi_text_char(t, '.');
        while (scale > 1) {
            scale /= 10u;
            clothi_text_char(t, (char)('0' + (int)(digits / scale % 10u)));
        }
        clothi_text_char(t, 'e');
        clothi_text_int(t, e10);
    }
}

/* A small format: %s text, %i int, %z size_t, %g double. */
static void clothi_text_format(clothi_text *t, const char *format, va_list args) {
    t->n = 0;
    t->buf[0] = '\0';
    for (; *format; format++) {
        if (*format != '%') {
            clothi_text_char(t, *format);
            continue;
        }
        switch (*++format) {
        case 's': clothi_text_string(t, va_arg(args, const char *)); break;
        case 'i': clothi_text_int(t, va_arg(args, int)); break;
        case 'z': clothi_text_uint(t, va_arg(args, size_t)); break;
        case 'g': clothi_text_double(t, va_arg(args, double)); break;
        default: clothi_text_char(t, '%'); format -= *format == '\0'; break;
        }
    }
}

/* Sends one sentence to the logger. */
CLOTHI_UNUSED static void clothi_say(const cloth_hooks *hooks, cloth_log_level level,
                                     cloth_status status, const char *format, ...) {
    clothi_text text;
    va_list     args;
    if (!hooks || !hooks->log.fn) return;
    va_start(args, format);
    clothi_text_format(&text, format, args);
    va_end(args);
    hooks->log.fn(level, status, text.buf, hooks->log.user);
}

/* Logs an error sentence and returns its status: `return clothi_fail(hooks, CLOTH_ERR_..., ...)` */
CLOTHI_UNUSED static cloth_status clothi_fail(const cloth_hooks *hooks, cloth_status status,
                                              const char *format, ...) {
    clothi_text text;
    va_list     args;
    if (hooks && hooks->log.fn) {
        va_start(args, format);
        clothi_text_format(&text, format, args);
        va_end(args);
        hooks->log.fn(CLOTH_LOG_ERROR, status, text.buf, hooks->log.user);
    }
    return status;
}

/* fn over [0, count) in ranges of about `grain` items; serial without a parallel hook. */
CLOTHI_UNUSED static void clothi_for(const cloth_hooks *hooks, int count, int grain,
                                     cloth_range_fn *fn, void *ctx) {
    if (count <= 0) return;
    if (grain < 1) grain = 1;
    if (hooks && hooks->parallel.run && count > grain)
        hooks->parallel.run(hooks->parallel.user, count, grain, fn, ctx);
    else
        fn(0, count, 0, ctx);
}

/* Seconds by the clock hook, 0 without one. */
CLOTHI_UNUSED static double clothi_now(const cloth_hooks *hooks) {
    return hooks && hooks->clock.fn ? hooks->clock.fn(hooks->clock.user) : 0.0;
}

CLOTH_API const char *cloth_status_text(cloth_status status) {
    switch (status) {
#define CLOTH_X(name, value, text) case name: return text;
    CLOTH_STATUS_LIST(CLOTH_X)
#undef CLOTH_X
    case CLOTH_STATUS_FORCE_INT: break;
    }
    return "an unknown status";
}

CLOTH_API int cloth_version(void) { return CLOTH_VERSION_NUM; }

/* ===== [4.1] MESH CHECK ====================================================================== */

/* ===== [4.2] TOPOLOGY ======================================================================== */

/* ===== [4.3] GENERATORS ====================================================================== */

/* ===== [4.4] REST SHAPE ====================================================================== */

/* ===== [4.5] OBJ FILES ======================================================================= */

/* ===== [5.1] MATERIALS ======================================================================= */
/*
 *   Y Pa, h m: a sheet that is pulled along one direction with free sides carries Y h (l^2-1)/2 l
 *   per width and narrows by nu. Only plane stress gives that back in two dimensions:
 *     mu = Y h/(2 (1+nu)),   lambda = Y h nu/(1-nu^2)                                        N/m
 *   The lambda of a solid, Y h nu/((1+nu)(1-2nu)), is that of a sheet held between two plates:
 *   it acts like Y/(1-nu^2) and nu/(1-nu), and grows without bound as nu goes to 1/2.
 *   Rigidity of a plate: D = Y h^3/(12 (1-nu^2)), N m. Yarns slide and bend one by one: cloth is
 *   no plate; give D where it was measured.
 *   Units: KES-FB2 gives B in gf cm^2/cm: 1 of it is 9.81e-5 N m. A cantilever's bending length c
 *   (m) means D = density * 9.81 m/s^2 * c^3.
 *
 *   cloth_material_li2021: as printed, W = mu |E|^2 + lambda/2 tr(E)^2 with E = F'F - I, which is
 *   twice Green's strain: W is 4 times as large, hence Y h = 4e5 N/m here; the 3D lambda; and
 *   E = 3/2 k |e|^2/(|n1|+|n2|) theta^2 with cross products n (|n| twice the area), D = 3/2 k =
 *   1.5e-6 N m for k = 1e-6. (With |n| the area it would be 3 k.) The list's "mu = 0.42" is
 *   Poisson's ratio. Density is not part of it: the default's.
 *
 *   Fabrics. [WOR11] measured ten; the numbers are those of its database as ARCSim ships it
 *   (materials: density; stretching rows C11 C12 C22 G, N/m; bending 3 x 5 values ke). The kit is
 *   isotropic, so: C = sqrt(C11 C22), nu = C12/C, Y h = C (1-nu^2); shear of real weaves is softer
 *   than Y h/(2(1+nu)). D = (mean of ke)/4, which is what ARCSim's energy amounts to on an
 *   equilateral mesh. [DRAPE22] lists linear bending coefficients of 618 unnamed fabrics with
 *   density. Damping was not measured: 0.
 *     cotton knit  gray-interlock, 60 % cotton 40 % polyester, t-shirt: density 0.187; row 4
 *                  124, 105, 366: C 213; nu 0.49 taken as 0.4; ke 21.8e-6
 *     denim        11oz-black-denim, 99 % cotton, jeans: 0.324; row 5 226, 41, 1058: C 489, nu 0.1
 *                  (rounded); ke 72.3e-6
 *     polyester    tango-red-jet-set, 100 % polyester, jacket: 0.113; row 4 107, 125, 365: C 198;
 *                  C12/C = 0.63 is no isotropic material's, nu 0.3 is an assumption; ke 18.8e-6
 *     twill        royal-target, 65 % cotton 35 % polyester, trousers: 0.220; row 5 2109, 72,
 *                  2124: C 2117, nu 0.03; ke 171e-6
 *     silk, wool   ORDER OF MAGNITUDE, no measured sheet was found. Densities 0.06 and 0.2 as
 *                  usual for dress silk and suiting; D 3e-6 and 1.2e-5 as typical of [DRAPE22] at
 *                  that density (rows from 1e-6 to 3e-5 and 3e-6 to 4e-5); membrane 500 N/m within
 *                  the four above; nu 0.3 assumed
 *   checked   tests/test_elements.c: material_values, material_refusals, material_uniaxial
 */

CLOTH_API cloth_material cloth_material_default(void) {
    cloth_material m;
    m.density = 0.2;
    m.young = 1e6;
    m.thickness = 5e-4;
    m.membrane = 0.0;
    m.poisson = 0.3;
    m.bending = 1e-5;
    m.damping = 0.0;
    m.plane = CLOTH_PLANE_STRESS;
    return m;
}

CLOTH_API cloth_material cloth_material_fabric(cloth_fabric fabric) {
    static const double table[6][4] = {     /* density, Y h, nu, D */
        {0.187, 180.0, 0.4, 5.4e-6},   {0.324, 484.0, 0.1, 1.8e-5}, {0.113, 180.0, 0.3, 4.7e-6},
        {0.220, 2115.0, 0.03, 4.3e-5}, {0.060, 500.0, 0.3, 3e-6},   {0.200, 500.0, 0.3, 1.2e-5}};
    cloth_material m = cloth_material_default();
    const int      i = (int)fabric;
    if (i < 0 || i > 5) return m;
    m.density = table[i][0];
    m.membrane = table[i][1];
    m.poisson = table[i][2];
    m.bending = table[i][3];
    return m;
}

CLOTH_API cloth_material cloth_material_li2021(void) {
    cloth_material m = cloth_material_default();
    m.membrane = 4e5;
    m.poisson = 0.42;
    m.bending = 1.5e-6;
    m.plane = CLOTH_PLANE_STRAIN_3D;
    return m;
}

static double clothi_membrane_stiffness(const cloth_material *m) {
    return m->membrane > 0.0 ? m->membrane : m->young * m->thickness;
}

CLOTH_API void cloth_material_lame(const cloth_material *m, double *mu, double *lambda) {
    const double stiffness = clothi_membrane_stiffness(m), nu = m->poisson;
    *mu = stiffness / (2.0 * (1.0 + nu));
    *lambda = m->plane == CLOTH_PLANE_STRAIN_3D ? stiffness * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
                                                : stiffness * nu / (1.0 - nu * nu);
}

CLOTH_API double cloth_material_rigidity(const cloth_material *m) {
    const double h = m->thickness, nu = m->poisson;
    return m->bending >= 0.0 ? m->bending
                             : clothi_membrane_stiffness(m) * h * h / (12.0 * (1.0 - nu * nu));
}

CLOTH_API cloth_status cloth_material_check(const cloth_hooks *hooks, const cloth_material *m,
                                            int region) {
    static const char *const name[7] = {"density", "young",   "thickness", "membrane",
                                        "poisson", "bending", "damping"};
    const double value[7] = {m->density, m->young,   m->thickness, m->membrane,
                             m->poisson, m->bending, m->damping};
    const char  *rule = NULL;
    double       mu, lambda;
    int          i;
    for (i = 0; i < 7; i++)
        if (!clothi_finite(value[i]))
            return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "material[%i].%s = %g", region, name[i],
                               value[i]);
    if (m->plane != CLOTH_PLANE_STRESS && m->plane != CLOTH_PLANE_STRAIN_3D)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "material[%i].plane = %i is no cloth_plane",
                           region, (int)m->plane);
    for (i = 0; i < 7 && !rule; i++) {
        if (i == 0 && !(value[i] > 0.0)) rule = "must be above 0";
        if ((i == 1 || i == 2 || i == 3 || i == 6) && value[i] < 0.0) rule = "must not be negative";
        if (i == 4 && !(value[i] > -1.0 && value[i] <= 0.5)) rule = "must lie in (-1, 0.5]";
        if (i == 4 && m->plane == CLOTH_PLANE_STRAIN_3D && !(value[i] < 0.5))
            rule = "must be below 0.5 for CLOTH_PLANE_STRAIN_3D";
    }
    if (rule)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "material[%i].%s = %g %s", region,
                           name[i - 1], value[i - 1], rule);
    cloth_material_lame(m, &mu, &lambda);
    if (!clothi_finite(mu) || !clothi_finite(lambda) || !clothi_finite(cloth_material_rigidity(m)))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "material[%i]: young = %g times thickness = %g is beyond any double",
                           region, m->young, m->thickness);
    return CLOTH_OK;
}

/* ===== [6.1] SPRING ========================================================================== */
/*
 *        x0 o~~~~~~~~~~o x1        symbols  d = x1 - x0,  l = |d|,  u = d/l
 *                                           L rest length m, k stiffness N/m
 *   energy    E = k/2 (l - L)^2                                                            J
 *   gradient  dE/dx1 = k (l - L) u = -dE/dx0          as dl/dx1 = u                        N
 *   Hessian   d2E/dx1dx1 = K, d2E/dx0dx1 = -K         as du/dx1 = (I - u u')/l             N/m
 *             K = k [ u u' + (1 - L/l) (I - u u') ] = k [ (1 - L/l) I + (L/l) u u' ]
 *   psd       the eigenvalues of K are k along u and k (1 - L/l), twice, across: the second is
 *             negative in compression (l < L) and then replaced by 0. The 6x6 matrix
 *             [K -K; -K K] has v' H v = (v1 - v0)' K (v1 - v0) >= 0.
 *   dropped   nothing. At l = 0 < L the direction u does not exist: below l = 1e-8 L the code takes
 *             u = d / (1e-8 L), which fades to zero, and the force with it. L = 0 is exact there.
 *   checked   tests/test_elements.c: spring_derivatives, spring_degenerate, lanes_spring
 */

CLOTH_API double cloth_spring(const double *x, double rest_length, double k, double *grad,
                              double *hess, int psd) {
    double d[3], l, lr, ratio, across, along, energy;
    int    i, j;
    clothi_sub3(x + 3, x, d);
    l = sqrt(clothi_dot3(d, d));
    lr = clothi_max(l, 1e-8 * rest_length);
    ratio = lr > 0.0 ? rest_length / lr : 0.0;
    across = psd ? clothi_max(1.0 - ratio, 0.0) : 1.0 - ratio;
    along = psd ? 1.0 - across : ratio;
    energy = 0.5 * k * (l - rest_length) * (l - rest_length);
    for (i = 0; i < 3; i++) {
        if (grad) {
            grad[3 + i] = k * (1.0 - ratio) * d[i];
            grad[i] = -grad[3 + i];
        }
        for (j = 0; hess && j < 3; j++) {
            const double uu = lr > 0.0 ? d[i] / lr * (d[j] / lr) : 0.0;
            const double K = k * ((i == j ? across : 0.0) + along * uu);
            hess[6 * i + j] = hess[6 * (i + 3) + j + 3] = K;
            hess[6 * (i + 3) + j] = hess[6 * i + j + 3] = -K;
        }
    }
    clothi_settle(grad, 6);
    clothi_settle(hess, 36);
    return clothi_finite(energy) ? energy : CLOTHI_HUGE;
}

/* ===== [6.2] STVK TRIANGLE =================================================================== */
/*
 *   rest, flat               now, in space
 *       X2                        x2           symbols  Dm = [X1-X0, X2-X0] 2x2, B = Dm^-1
 *      /  \         F            /   \                  Ds = [x1-x0, x2-x0] 3x2
 *     /  A \      ----->        /     \                 A = |det Dm|/2 rest area, m^2
 *   X0 ---- X1                x0 ----- x1               mu, lambda N/m (Pa times thickness)
 *
 *   The map is linear in the triangle, so its derivative is one matrix:
 *     F = Ds B (3x2)                     deformation gradient: edges now = F edges at rest
 *     E = 1/2 (F'F - I) (2x2)            Green strain: dX' E dX = (|dx|^2 - |dX|^2)/2
 *     S = 2 mu E + lambda tr(E) I        stress that is conjugate to E
 *     J = A ( mu |E|^2 + lambda/2 tr(E)^2 ),  dJ = A S:dE                        [StVK]
 *
 *   Write F = sum_i x_i g_i' with the gradients g_i of the corner functions: g_1, g_2 are the rows
 *   of B, and g_0 = -g_1 - g_2 since the three functions sum to one. A change v of corner i gives
 *     dF = v g_i',   dE = 1/2 (F'dF + dF'F),   S:dE = v . F S g_i        (S is symmetric)
 *   so  gradient  dJ/dx_i = A F S g_i.                                                        N
 *   Change that by w at corner j: A [ w (g_j' S g_i) + F dS g_i ]. With q_i = F g_i and g_ij =
 *   g_i.g_j:  dE g_i = 1/2 (F' w g_ij + g_j q_i.w),  tr dE = w.q_j,  hence
 *     Hessian   H_ij = A [ mu ( g_ij F F' + q_j q_i' ) + lambda q_i q_j' + (g_i' S g_j) I ]  N/m
 *   The bracket's last term is the stress at work on the rotation of the triangle: S < 0, as in any
 *   compressed cloth, pushes it out of its plane, and the exact Hessian is then indefinite.
 *
 *   psd       S is replaced in that last term by its positive part S+ (the eigenvalues of a 2x2
 *             matrix are in closed form). Proof: for any corner displacements v_i,
 *               v' H v = A [ 2 mu |dE|^2 + lambda tr(dE)^2 + sum over axes of z' S+ z ],
 *             z = sum_i (v_i)_axis g_i. With dE = dev dE + tr(dE)/2 I the first two terms are
 *             2 mu |dev dE|^2 + (mu + lambda) tr(dE)^2 >= 0, and the third is >= 0 by choice.
 *             What is lost: negative S acting inside the plane, where the material may outweigh
 *             it. Cost: slower Newton steps in strong compression.
 *   limits    in pure compression the force falls again below the stretch 1/sqrt(3) and vanishes at
 *             zero area: a triangle can collapse and come out mirrored. See the smallest stretch.
 *   collapse  of the current triangle is harmless (everything is polynomial in x). A rest triangle
 *             with det Dm = 0 has no B: energy and derivatives are 0.
 *   checked   tests/test_elements.c: stretch_derivatives, stretch_closed_forms, stretch_table,
 *             stretch_psd, stretch_invariance, stretch_degenerate
 */

/* B [2x2] and the area; zeros when the rest triangle has none. */
static double clothi_rest_inverse(const double *X, double *B) {
    const double a = X[2] - X[0], b = X[4] - X[0], c = X[3] - X[1], d = X[5] - X[1];
    const double det = a * d - b * c;
    memset(B, 0, 4 * sizeof *B);
    if (!(det < 0.0 || det > 0.0)) return 0.0;
    B[0] = d / det;
    B[1] = -b / det;
    B[2] = -c / det;
    B[3] = a / det;
    return 0.5 * fabs(det);
}

/* F [3x2] = Ds B */
static void clothi_deformation(const double *x, const double *B, double *F) {
    int i;
    for (i = 0; i < 3; i++) {
        const double e1 = x[3 + i] - x[i], e2 = x[6 + i] - x[i];
        F[2 * i] = e1 * B[0] + e2 * B[2];
        F[2 * i + 1] = e1 * B[1] + e2 * B[3];
    }
}

/* E as (E11, E22, E12) */
static void clothi_green_strain(const double *F, double *E) {
    E[0] = 0.5 * (F[0] * F[0] + F[2] * F[2] + F[4] * F[4] - 1.0);
    E[1] = 0.5 * (F[1] * F[1] + F[3] * F[3] + F[5] * F[5] - 1.0);
    E[2] = 0.5 * (F[0] * F[1] + F[2] * F[3] + F[4] * F[5]);
}

/* S as (S11, S22, S12) */
static void clothi_stvk_stress(const double *E, double mu, double lambda, double *S) {
    S[0] = 2.0 * mu * E[0] + lambda * (E[0] + E[1]);
    S[1] = 2.0 * mu * E[1] + lambda * (E[0] + E[1]);
    S[2] = 2.0 * mu * E[2];
}

/* S+ = a S + b I with a, b from the eigenvalues mean +- r; r = 0 makes a = 0 and b = mean+. */
static void clothi_positive_part(double *S) {
    const double mean = 0.5 * (S[0] + S[1]), half = 0.5 * (S[0] - S[1]);
    const double r = sqrt(half * half + S[2] * S[2]);
    const double hi = clothi_max(mean + r, 0.0), lo = clothi_max(mean - r, 0.0);
    const double a = r > 0.0 ? 0.5 * (hi - lo) / r : 0.0, b = 0.5 * (hi + lo) - a * mean;
    S[0] = a * S[0] + b;
    S[1] = a * S[1] + b;
    S[2] = a * S[2];
}

CLOTH_API double cloth_stretch(const double *x, const double *X, double mu, double lambda,
                               double *grad, double *hess, int psd) {
    double B[4], F[6], E[3], S[3], g[3][2], q[3][3], energy;
    int    i, j, r, c;
    const double area = clothi_rest_inverse(X, B);
    clothi_deformation(x, B, F);
    clothi_green_strain(F, E);
    clothi_stvk_stress(E, mu, lambda, S);
    energy = 0.5 * area * (S[0] * E[0] + S[1] * E[1] + 2.0 * S[2] * E[2]);
    for (j = 0; j < 2; j++) {
        g[1][j] = B[j];
        g[2][j] = B[2 + j];
        g[0][j] = -B[j] - B[2 + j];
    }
    for (i = 0; i < 3; i++)
        for (r = 0; r < 3; r++) {
            q[i][r] = F[2 * r] * g[i][0] + F[2 * r + 1] * g[i][1];
            if (grad)
                grad[3 * i + r] = area * (F[2 * r] * (S[0] * g[i][0] + S[2] * g[i][1])
                                          + F[2 * r + 1] * (S[2] * g[i][0] + S[1] * g[i][1]));
        }
    if (hess && psd) clothi_positive_part(S);
    for (i = 0; hess && i < 3; i++)
        for (j = 0; j < 3; j++) {
            const double gg = g[i][0] * g[j][0] + g[i][1] * g[j][1];
            const double gSg = S[0] * g[i][0] * g[j][0] + S[1] * g[i][1] * g[j][1]
                               + S[2] * (g[i][0] * g[j][1] + g[i][1] * g[j][0]);
            for (r = 0; r < 3; r++)
                for (c = 0; c < 3; c++) {
                    const double FF = F[2 * r] * F[2 * c] + F[2 * r + 1] * F[2 * c + 1];
                    hess[9 * (3 * i + r) + 3 * j + c] =
                        area * (mu * (gg * FF + q[j][r] * q[i][c]) + lambda * q[i][r] * q[j][c]
                                + (r == c ? gSg : 0.0));
                }
        }
    clothi_settle(grad, 9);
    clothi_settle(hess, 81);
    return clothi_finite(energy) ? energy : CLOTHI_HUGE;
}

/* The stretches are the singular values of F: s1^2 and s2^2 are the eigenvalues of F'F, and s1 s2 =
 * |F1 x F2| keeps the digits of the small one. F is scaled so that no square overflows. */
static void clothi_principal_stretches(const double *F, double *stretch) {
    double a[3], b[3], n[3], aa, bb, ab, s1, big = 0.0;
    int    i;
    for (i = 0; i < 6; i++) big = clothi_max(big, fabs(F[i]));
    stretch[0] = stretch[1] = 0.0;
    if (!(big > 0.0)) return;
    for (i = 0; i < 3; i++) {
        a[i] = F[2 * i] / big;
        b[i] = F[2 * i + 1] / big;
    }
    aa = clothi_dot3(a, a);
    bb = clothi_dot3(b, b);
    ab = clothi_dot3(a, b);
    clothi_cross3(a, b, n);
    s1 = sqrt(0.5 * (aa + bb + sqrt((aa - bb) * (aa - bb) + 4.0 * ab * ab)));
    stretch[0] = s1 * big;
    stretch[1] = sqrt(clothi_dot3(n, n)) / s1 * big;
}

CLOTH_API double cloth_stretch_state(const double *x, const double *X, double mu, double lambda,
                                     double *F, double *E, double *S, double *stretch) {
    double       B[4], f[6] = {0, 0, 0, 0, 0, 0}, e[3] = {0, 0, 0}, s[3] = {0, 0, 0}, st[2];
    const double area = clothi_rest_inverse(X, B);
    if (area > 0.0) {
        clothi_deformation(x, B, f);
        clothi_settle(f, 6);
        clothi_green_strain(f, e);
        clothi_settle(e, 3);
        clothi_stvk_stress(e, mu, lambda, s);
        clothi_settle(s, 3);
    }
    clothi_principal_stretches(f, st);
    clothi_settle(st, 2);
    if (F) memcpy(F, f, sizeof f);
    if (stretch) memcpy(stretch, st, sizeof st);
    if (E) {
        E[0] = e[0];
        E[3] = e[1];
        E[1] = E[2] = e[2];
    }
    if (S) {
        S[0] = s[0];
        S[3] = s[1];
        S[1] = S[2] = s[2];
    }
    return clothi_finite(area) ? area : CLOTHI_HUGE;
}

/* ===== [6.3] HINGE =========================================================================== */
/*
 *            x2                symbols  e = x1-x0, a = x2-x0, b = x3-x0, l = |e|, u = e/l
 *           /  \                        n1 = e x a, n2 = b x e normals, |n| = twice the area
 *     n1   /    \                       for each wing: nn = n/|n|, height h = |n|/l,
 *         /      \                        foot t = (corner - x0).u/l (0 at x0, 1 at x1),
 *       x0 --e--> x1                      m the unit vector in its plane from edge to corner
 *         \      /             theta    = atan2( (n1 x n2).u, n1.n2 ) = atan2( -l n1.b, n1.n2 )
 *     n2   \    /                       in [-pi, pi]: 0 flat, > 0 convex on the normals' side
 *           \  /               energy   J = c/2 (theta - theta0)^2, not wrapped            [DS]
 *            x3                c        = D l^2/(A1 + A2) with rest length and areas, N m
 *
 *   (n1 x n2).e = ((e x a) x (b x e)).e = -l^2 (n1.b), as n1.e = 0: one cross product less.
 *
 *   c         A surface with curvatures K_mm across an edge and K_tt along it, sampled at the
 *             corners of equilateral triangles (height h, edge l, l^2/(4 h^2) = 1/3), shows
 *             the hinge angle
 *               theta = h K_mm - l^2/(4 h) K_tt = h (K_mm - K_tt/3).
 *             A cylinder of curvature k at the angle f to m: K_mm = k cos^2 f, K_tt = k sin^2 f, so
 *             theta = h k (1 + 2 cos 2f)/3; over the three edge directions f, f +- 60 degrees the
 *             squares add up to h^2 k^2, whatever f is. Each direction has one edge per l h of area
 *             (and A1 + A2 = l h): the energy per area is (c/2) h^2 k^2/(l h). The plate's is
 *             D k^2/2, so D = c h/l, which is c = D l^2/(A1+A2). On other meshes the same c gives a
 *             rigidity that depends on pattern and direction, up to 3 D.
 *
 *   gradient  Lifting x2 by d along nn1 turns its wing by d/h1 towards the normal, so theta falls:
 *               dtheta/dx2 = -nn1/h1 =: -p1          and dtheta/dx3 = -p2 likewise.
 *             A rigid motion leaves theta alone: no net force and no net torque. Of all ways to
 *             split +p1 between x0 and x1 only the foot's own lever balances the torque:
 *               dtheta/dx_i = -sum over wings of W_i p,   W = (t - 1, -t, 1) on (x0, x1, corner)
 *
 *   Hessian   Each wing's part depends on its own three corners. Frame: u, m, nn with m = nn x u
 *             (left wing; the right one is its mirror image and gets the same formulas). Write
 *             p = nn/h = l n/|n|^2, M = m/h, r = u/l, D = (1, -1, 0) on (x0, x1, corner).
 *             Corner moved by v: dn = e x v = l (nn m' - m nn') v, and d(n/|n|^2) =
 *             (I - 2 nn nn') dn/|n|^2, so dp = -(p M' + M p') v. x1 moved by v: dn = -a x v with
 *             a = t l u + h m, and dl = u.v: dp = [ t (p M' + M p') - r p' ] v. x0: minus the sum.
 *             Together, and with dt from t = a.e/l^2,
 *               dp/dx_j = -W_j (p M' + M p') + D_j r p',    dt/dx_j = W_j r' - D_j (h/l)^2 M'.
 *             W_i changes by D_i dt. So, with z_i = W_i M - D_i r,
 *               d2theta/dx_i dx_j = sum over wings of
 *                 W_j p z_i' + W_i z_j p' + D_i D_j (h/l)^2/2 (p M' + M p').
 *             (The last term comes out as (h/l)^2 p M' = nn m'/l^2; its antisymmetric half is
 *             a rotation about u, opposite in the two wings, and cancels.)
 *   energy    dJ = c (theta - theta0) dtheta;  d2J = c [ dtheta dtheta' + (theta-theta0) d2theta ]
 *   psd       Gauss-Newton: c dtheta dtheta' alone. It is a square, hence >= 0. Dropped is the
 *             second term: nothing at theta = theta0, slower Newton steps at strongly bent hinges.
 *   collapse  p grows like 1/h. With s = |e|^2 + |a|^2 + |b|^2, |n| is not taken
 *             smaller than 1e-6 s, nor l^2 smaller than 1e-12 s, where they divide: derivatives are
 *             exact above and fade to zero below, where the force would be beyond any use. theta
 *             itself is atan2's answer, 0 for a wing with n = 0: a line has no side.
 *   range     theta does not depend on size: coordinates outside 1e-20..1e20 are scaled first.
 *   limits    at theta = +-pi (a wing folded onto the other) theta jumps; count hinges beyond 3.
 *             The Poisson ratio of bending is about -1/3 whatever the user says.
 *   checked   tests/test_elements.c: hinge_derivatives, hinge_near_degenerate, hinge_sign,
 *             hinge_cylinder, hinge_invariance, hinge_degenerate, lanes_hinge
 */

#define CLOTHI_HINGE_FLOOR 1e-12            /* the square of the smallest relative |n|           */
#define CLOTHI_HINGE_TINY_L2 1e-60          /* m^2 and m^4: keep 0/0 away when all corners       */
#define CLOTHI_HINGE_TINY_Q  1e-100         /* coincide                                          */

typedef struct clothi_wing {
    double n[3];                            /* normal, |n| = twice the area                      */
    double t;                               /* foot of the corner on the edge                    */
    double p[3];                            /* n/(|n| h)                                         */
    double z[3][3];                         /* z of x0, x1 and the corner                        */
    double km[3];                           /* (h/l)^2/2 M                                       */
} clothi_wing;

typedef struct clothi_hinge {
    double      scale;                      /* what x was multiplied by, a power of two          */
    double      theta;
    clothi_wing wing[2];
} clothi_hinge;

/* s: sum of the squared edges from x0. side +1: left wing, n = e x a; -1: right wing, n = a x e. */
static void clothi_wing_build(const double *e, const double *a, double s, double side,
                              clothi_wing *w) {
    const double l2 = clothi_dot3(e, e), l = sqrt(l2);
    const double l2c = clothi_max(l2, CLOTHI_HINGE_FLOOR * s + CLOTHI_HINGE_TINY_L2);
    double       q, qc;
    int          i;
    clothi_cross3(e, a, w->n);
    q = clothi_dot3(w->n, w->n);
    qc = clothi_max(q, CLOTHI_HINGE_FLOOR * s * s + CLOTHI_HINGE_TINY_Q);
    w->t = clothi_dot3(a, e) / l2c;
    for (i = 0; i < 3; i++) {
        const double h = a[i] - w->t * e[i], M = h * (l2c / qc), r = e[i] / l2c;
        w->n[i] *= side;
        w->p[i] = w->n[i] * (l / qc);
        w->z[0][i] = (w->t - 1.0) * M - r;
        w->z[1][i] = -w->t * M + r;
        w->z[2][i] = M;
        w->km[i] = 0.5 * (q / qc) * h / l2c;
    }
}

static void clothi_hinge_build(const double *x, clothi_hinge *g) {
    double y[12], e[3], a[3], b[3], big = 0.0, l, s;
    int    i, exponent;
    for (i = 0; i < 12; i++) big = clothi_max(big, fabs(x[i]));
    g->scale = 1.0;
    if (big > 1e20 || (big < 1e-20 && big > 0.0)) {
        (void)frexp(big, &exponent);
        g->scale = ldexp(1.0, exponent > 1000 ? -1000 : exponent < -1000 ? 1000 : -exponent);
    }
    for (i = 0; i < 12; i++) y[i] = x[i] * g->scale;
    clothi_sub3(y + 3, y, e);
    clothi_sub3(y + 6, y, a);
    clothi_sub3(y + 9, y, b);
    s = clothi_dot3(e, e) + clothi_dot3(a, a) + clothi_dot3(b, b);
    clothi_wing_build(e, a, s, 1.0, &g->wing[0]);
    clothi_wing_build(e, b, s, -1.0, &g->wing[1]);
    l = sqrt(clothi_dot3(e, e));
    g->theta = clothi_atan2(-l * clothi_dot3(g->wing[0].n, b),
                            clothi_dot3(g->wing[0].n, g->wing[1].n));
}

/* wing k has the corners 0, 1 and 2 + k of the hinge */
static void clothi_hinge_gradient(const clothi_hinge *g, double *grad) {
    int k, i;
    memset(grad, 0, 12 * sizeof *grad);
    for (k = 0; k < 2; k++) {
        const clothi_wing *w = &g->wing[k];
        for (i = 0; i < 3; i++) {
            const double p = w->p[i] * g->scale;
            grad[i] += (1.0 - w->t) * p;
            grad[3 + i] += w->t * p;
            grad[6 + 3 * k + i] = -p;
        }
    }
}

static void clothi_hinge_hessian(const clothi_hinge *g, double *hess) {
    static const double D[3] = {1.0, -1.0, 0.0};
    const double        ss = g->scale * g->scale;
    int                 k, i, j, r, c;
    memset(hess, 0, 144 * sizeof *hess);
    for (k = 0; k < 2; k++) {
        const clothi_wing *w = &g->wing[k];
        const double       W[3] = {w->t - 1.0, -w->t, 1.0};
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++)
                for (r = 0; r < 3; r++)
                    for (c = 0; c < 3; c++) {
                        const int row = 3 * (i < 2 ? i : 2 + k) + r;
                        const int col = 3 * (j < 2 ? j : 2 + k) + c;
                        hess[12 * row + col] +=
                            ss * (W[j] * w->p[r] * w->z[i][c] + W[i] * w->z[j][r] * w->p[c]
                                  + D[i] * D[j] * (w->p[r] * w->km[c] + w->km[r] * w->p[c]));
                    }
    }
}

CLOTH_API double cloth_dihedral_hess(const double *x, double *grad, double *hess) {
    clothi_hinge g;
    clothi_hinge_build(x, &g);
    if (grad) clothi_hinge_gradient(&g, grad);
    if (hess) clothi_hinge_hessian(&g, hess);
    clothi_settle(grad, 12);
    clothi_settle(hess, 144);
    return clothi_finite(g.theta) ? g.theta : 0.0;
}

CLOTH_API double cloth_dihedral_grad(const double *x, double *grad) {
    return cloth_dihedral_hess(x, grad, NULL);
}

CLOTH_API double cloth_dihedral(const double *x) { return cloth_dihedral_hess(x, NULL, NULL); }

CLOTH_API double cloth_hinge_coefficient(double D, double e2, double A1, double A2) {
    const double area = A1 + A2;
    const double c = area > 0.0 ? D * e2 / area : 0.0;
    return clothi_finite(c) ? c : CLOTHI_HUGE;
}

CLOTH_API double cloth_bend(const double *x, double c, double theta0, double *grad, double *hess,
                            int psd) {
    double       dtheta[12];
    int          i, j;
    const double bent = cloth_dihedral_hess(x, grad || hess ? dtheta : NULL, psd ? NULL : hess)
                        - theta0;
    const double energy = 0.5 * c * bent * bent;
    if (hess)
        for (i = 0; i < 12; i++)
            for (j = 0; j < 12; j++)
                hess[12 * i + j] = c * (dtheta[i] * dtheta[j]
                                        + (psd ? 0.0 : bent * hess[12 * i + j]));
    if (grad)
        for (i = 0; i < 12; i++) grad[i] = c * bent * dtheta[i];
    clothi_settle(grad, 12);
    clothi_settle(hess, 144);
    return clothi_finite(energy) ? energy : CLOTHI_HUGE;
}

/* ===== [6.4] QUADRATIC BENDING =============================================================== */
/*
 *   near the flat state   theta = |sum_i w_i x_i| for small angles, so the angle need not be
 *                         computed at all: one weighted sum of the four corners            [BERGOU]
 *   symbols   corners, t and h as in [6.3], from the REST shape; c the hinge's, N m
 *   weights   w2 = -1/h1, w3 = -1/h2, w0 = (1-t1)/h1 + (1-t2)/h2, w1 = t1/h1 + t2/h2       1/m
 *             They sum to zero and reproduce the flat rest shape: sum_i w_i X_i = 0, for the foot
 *             (1-t) X0 + t X1 is the corner's projection, and the two unit vectors that remain,
 *             from either corner to the edge, cancel.
 *   energy    J = c/2 |sum_i w_i x_i|^2
 *   gradient  c w_i s, s = sum_j w_j x_j          Hessian  c w_i w_j I, constant: assembled once
 *   link      at the flat state dtheta/dx_i = w_i nn (compare [6.3]), so the hinge's Hessian is
 *             c w_i w_j nn nn': the same in the normal direction, and D means the same. The two
 *             other directions are of second order while the sheet keeps its lengths.
 *   dropped   rest angles (flat only) and large-stretch exactness: stretching a flat sheet unevenly
 *             costs a little bending energy. Its error against [6.3] grows as theta^2.
 *   checked   tests/test_elements.c: quadratic_is_the_flat_hinge, hinge_cylinder,
 *             lanes_quadratic
 */

CLOTH_API double cloth_bend_quadratic(const double *x, const double *w, double c, double *grad,
                                      double *hess) {
    double s[3], energy;
    int    i, j, r;
    for (r = 0; r < 3; r++)                 /* edges first: far from the origin digits survive   */
        s[r] = w[1] * (x[3 + r] - x[r]) + w[2] * (x[6 + r] - x[r]) + w[3] * (x[9 + r] - x[r]);
    energy = 0.5 * c * clothi_dot3(s, s);
    if (hess) memset(hess, 0, 144 * sizeof *hess);
    for (i = 0; i < 4; i++)
        for (r = 0; r < 3; r++) {
            if (grad) grad[3 * i + r] = c * w[i] * s[r];
            for (j = 0; hess && j < 4; j++) hess[12 * (3 * i + r) + 3 * j + r] = c * w[i] * w[j];
        }
    clothi_settle(grad, 12);
    clothi_settle(hess, 144);
    return clothi_finite(energy) ? energy : CLOTHI_HUGE;
}

CLOTH_API void cloth_bend_quadratic_weights(const double *x_rest, double *w) {
    double e[3], l2;
    int    k;
    clothi_sub3(x_rest + 3, x_rest, e);
    l2 = clothi_dot3(e, e);
    memset(w, 0, 4 * sizeof *w);
    for (k = 0; k < 2; k++) {
        double a[3], n[3], t, h;
        clothi_sub3(x_rest + 6 + 3 * k, x_rest, a);
        clothi_cross3(e, a, n);
        t = l2 > 0.0 ? clothi_dot3(a, e) / l2 : 0.0;
        h = l2 > 0.0 ? sqrt(clothi_dot3(n, n) / l2) : 0.0;
        if (!(h > 0.0)) {
            memset(w, 0, 4 * sizeof *w);
            return;
        }
        w[0] += (1.0 - t) / h;
        w[1] += t / h;
        w[2 + k] = -1.0 / h;
    }
    clothi_settle(w, 4);
}

/* The hinge x [4x3] of two flat rest triangles that share an edge, unfolded into the plane: P [3x2]
 * is the left one with the corner p opposite the edge, Q the right one with the corner q. Both must
 * be counterclockwise. The edge gets the mean of its two lengths (pattern pieces sewn together need
 * not agree). area [2]; returns 0, and x unset, when the edge has no length. */
CLOTHI_UNUSED static int clothi_hinge_unfold(const double *P, int p, const double *Q, int q,
                                             double *x, double *area) {
    const double *tri[2] = {P, Q};
    const int     apex[2] = {p, q};
    double        length[2], foot[2], height[2];
    int           k;
    for (k = 0; k < 2; k++) {
        const double *c = tri[k] + 2 * apex[k];
        const double *a = tri[k] + 2 * ((apex[k] + 1 + k) % 3);     /* x0 of the hinge */
        const double *b = tri[k] + 2 * ((apex[k] + 2 - k) % 3);     /* x1 */
        const double  e0 = b[0] - a[0], e1 = b[1] - a[1], c0 = c[0] - a[0], c1 = c[1] - a[1];
        const double  l2 = e0 * e0 + e1 * e1, cross = fabs(e0 * c1 - e1 * c0);
        if (!(l2 > 0.0)) return 0;
        length[k] = sqrt(l2);
        foot[k] = (c0 * e0 + c1 * e1) / length[k];
        height[k] = cross / length[k];
        area[k] = 0.5 * cross;
    }
    memset(x, 0, 12 * sizeof *x);
    x[3] = 0.5 * (length[0] + length[1]);
    x[6] = foot[0] / length[0] * x[3];
    x[7] = height[0];
    x[9] = foot[1] / length[1] * x[3];
    x[10] = -height[1];
    return 1;
}

/* ===== [6.5] EIGHT ELEMENTS AT A TIME ======================================================== */
/*
 *   a batch: 8 elements, one array per number           x [9][8]: corner*3 + axis, then the lane
 *
 *      lane   0   1   2   3   4   5   6   7             The loops below run over lanes and have
 *   x0.x      .   .   .   .   .   .   .   .             no branch, so that gcc and clang turn
 *   x0.y      .   .   .   .   .   .   .   .             them into vector code by themselves.
 *   ...                                                 Unused lanes repeat a valid element with
 *                                                       zero stiffness.
 *   The formulas are those of [6.1] to [6.4]; the scalar functions there are their tests. What
 *   differs: one division serves three quotients, Hessian blocks of corner 0 follow from the others
 *   (moving all corners changes no force, so rows of blocks sum to zero), and a result beyond the
 *   range of doubles is left as inf or NaN for the step to refuse. Lengths are expected within
 *   1e-20 .. 1e20 m. Hessians hold one triangle of blocks, each [3x3] row-major: diagonal blocks
 *   first, then (row corner, column corner) = 10 20 21 30 31 32.
 *
 *   damping   of the rate of strain and of the hinge's rate of turning, over the step from x^n:
 *               Ed = (tau/h) A ( mu |E - E^n|^2 + lambda/2 tr(E - E^n)^2 ),
 *               Ed = (tau/h) c/2 (theta - theta^n)^2
 *             with tau the material's time, h the step: dEd/dx = tau d/dt of the elastic force for
 *             small steps. Strain and angle do not change in a rigid motion, so that nothing is
 *             taken from it. damp [8] holds tau/h.
 *   forces    are stored per element and summed per vertex from a list in a fixed order: no
 *             colouring, no atomics, the same bits for any number of workers.
 *   calls     clothi_gather_lanes, then one of
 *               clothi_stretch_forces | _forces_damped | _energies | _losses | _lanes (everything),
 *               clothi_hinge_forces | _forces_damped | _lanes (everything), clothi_theta_lanes,
 *               clothi_strain_lanes, clothi_smallest_stretch2,
 *               clothi_quadratic_forces | _energies | _lanes,  clothi_spring_lanes,
 *             then clothi_sum_corners. _lanes calls take NULL for what is not wanted.
 *   checked   tests/test_elements.c: lanes_stretch, lanes_hinge, lanes_quadratic, lanes_spring,
 *             lanes_damping, lanes_gather
 */

#define CLOTHI_LANES 8

/* Never inlined: knowledge of the caller's arrays has led clang to load them a round ahead, which
 * keeps a loop scalar. O3: gcc leaves some of these loops scalar below. */
#if defined(__clang__)
#  define CLOTHI_HOT static CLOTHI_UNUSED __attribute__((noinline))
#elif defined(__GNUC__) && defined(__OPTIMIZE__) && !defined(__OPTIMIZE_SIZE__)
#  define CLOTHI_HOT static CLOTHI_UNUSED __attribute__((noinline, optimize("O3")))
#else
#  define CLOTHI_HOT static CLOTHI_UNUSED
#endif
#if defined(__GNUC__)
#  define CLOTHI_LANE static inline __attribute__((always_inline, unused))
#else
#  define CLOTHI_LANE static inline
#endif

/* sqrt may set errno, which keeps compilers from vectorising it. */
CLOTHI_HOT void clothi_sqrt_lanes(double *a) {
#if defined(CLOTHI_AVX)
    _mm256_storeu_pd(a, _mm256_sqrt_pd(_mm256_loadu_pd(a)));
    _mm256_storeu_pd(a + 4, _mm256_sqrt_pd(_mm256_loadu_pd(a + 4)));
#elif defined(CLOTHI_SSE2)
    int k;
    for (k = 0; k < CLOTHI_LANES; k += 2) _mm_storeu_pd(a + k, _mm_sqrt_pd(_mm_loadu_pd(a + k)));
#else
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) a[k] = sqrt(a[k]);
#endif
}

/* Positions of 8 elements into out [corners*3][8]: x [nv x 3], index [corners][8] vertices. */
CLOTHI_HOT void clothi_gather_lanes(const double *CLOTHI_RESTRICT x,
                                    const int *CLOTHI_RESTRICT index, int corners,
                                    double *CLOTHI_RESTRICT out) {
    int c, k;
#if defined(CLOTHI_AVX)
    for (c = 0; c < corners; c++)
        for (k = 0; k < CLOTHI_LANES; k += 4) {
            const double *a = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k];
            const double *b = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k + 1];
            const double *p = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k + 2];
            const double *q = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k + 3];
            double       *o = out + 3 * CLOTHI_LANES * c + k;
            /* (ax ay px py), (bx by qx qy): the unpacking gives x and y in the order a b p q */
            const __m256d ap = _mm256_insertf128_pd(_mm256_castpd128_pd256(_mm_loadu_pd(a)),
                                                    _mm_loadu_pd(p), 1);
            const __m256d bq = _mm256_insertf128_pd(_mm256_castpd128_pd256(_mm_loadu_pd(b)),
                                                    _mm_loadu_pd(q), 1);
            const __m128d ab_z = _mm_loadh_pd(_mm_load_sd(a + 2), b + 2);
            const __m128d pq_z = _mm_loadh_pd(_mm_load_sd(p + 2), q + 2);
            _mm256_storeu_pd(o, _mm256_unpacklo_pd(ap, bq));
            _mm256_storeu_pd(o + CLOTHI_LANES, _mm256_unpackhi_pd(ap, bq));
            _mm256_storeu_pd(o + 2 * CLOTHI_LANES,
                             _mm256_insertf128_pd(_mm256_castpd128_pd256(ab_z), pq_z, 1));
        }
#elif defined(CLOTHI_SSE2)
    for (c = 0; c < corners; c++)
        for (k = 0; k < CLOTHI_LANES; k += 2) {
            const double *a = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k];
            const double *b = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k + 1];
            double       *o = out + 3 * CLOTHI_LANES * c + k;
            const __m128d va = _mm_loadu_pd(a), vb = _mm_loadu_pd(b);
            _mm_storeu_pd(o, _mm_unpacklo_pd(va, vb));
            _mm_storeu_pd(o + CLOTHI_LANES, _mm_unpackhi_pd(va, vb));
            _mm_storeu_pd(o + 2 * CLOTHI_LANES, _mm_loadh_pd(_mm_load_sd(a + 2), b + 2));
        }
#else
    for (c = 0; c < corners; c++)
        for (k = 0; k < CLOTHI_LANES; k++) {
            const double *a = x + 3 * (ptrdiff_t)index[CLOTHI_LANES * c + k];
            out[CLOTHI_LANES * (3 * c) + k] = a[0];
            out[CLOTHI_LANES * (3 * c + 1) + k] = a[1];
            out[CLOTHI_LANES * (3 * c + 2) + k] = a[2];
        }
#endif
}

/* f [nv x 3] of the vertices [begin, end) = scale times the sum of their corners' entries in the
 * batches' forces: entry[start[v] .. start[v+1]) are offsets of the axis x, y and z lie 8 and 16
 * further. */
CLOTHI_HOT void clothi_sum_corners(const double *CLOTHI_RESTRICT forces,
                                   const int *CLOTHI_RESTRICT start,
                                   const int *CLOTHI_RESTRICT entry, int begin, int end,
                                   double scale, double *CLOTHI_RESTRICT f) {
    int v, k;
    for (v = begin; v < end; v++) {
        double s0 = 0.0, s1 = 0.0, s2 = 0.0;
        for (k = start[v]; k < start[v + 1]; k++) {
            const double *e = forces + entry[k];
            s0 += e[0];
            s1 += e[CLOTHI_LANES];
            s2 += e[2 * CLOTHI_LANES];
        }
        f[3 * v] = scale * s0;
        f[3 * v + 1] = scale * s1;
        f[3 * v + 2] = scale * s2;
    }
}

/* --- springs: x [6][8], rest [2][8] k and L, H [3][9][8] --- */

CLOTHI_HOT void clothi_spring_lanes(const double *CLOTHI_RESTRICT x,
                                    const double *CLOTHI_RESTRICT rest,
                                    double *CLOTHI_RESTRICT E, double *CLOTHI_RESTRICT f,
                                    double *CLOTHI_RESTRICT H, int psd) {
    enum { L = CLOTHI_LANES };
    double len[L], across[L], along[L], u[3][L];
    int    k, i, j;
    for (k = 0; k < L; k++) {
        const double d0 = x[3 * L + k] - x[k], d1 = x[4 * L + k] - x[L + k];
        const double d2 = x[5 * L + k] - x[2 * L + k];
        len[k] = d0 * d0 + d1 * d1 + d2 * d2;
    }
    clothi_sqrt_lanes(len);
    for (k = 0; k < L; k++) {
        const double d0 = x[3 * L + k] - x[k], d1 = x[4 * L + k] - x[L + k];
        const double d2 = x[5 * L + k] - x[2 * L + k], s = rest[k], r = rest[L + k];
        const double floor_ = 1e-8 * r, lr = len[k] > floor_ ? len[k] : floor_;
        const double inv = 1.0 / (lr + 1e-300), stiff = s * (1.0 - r * inv);
        u[0][k] = d0 * inv;
        u[1][k] = d1 * inv;
        u[2][k] = d2 * inv;
        across[k] = psd ? 0.5 * (stiff + fabs(stiff)) : stiff;
        along[k] = s - across[k];
        if (E) E[k] = 0.5 * s * (len[k] - r) * (len[k] - r);
        if (f) {
            f[k] = -stiff * d0;
            f[L + k] = -stiff * d1;
            f[2 * L + k] = -stiff * d2;
            f[3 * L + k] = stiff * d0;
            f[4 * L + k] = stiff * d1;
            f[5 * L + k] = stiff * d2;
        }
    }
    for (i = 0; H && i < 3; i++)
        for (j = 0; j < 3; j++)
            for (k = 0; k < L; k++) {
                const double K = along[k] * u[i][k] * u[j][k] + (i == j ? across[k] : 0.0);
                H[(3 * i + j) * L + k] = H[(9 + 3 * i + j) * L + k] = K;
                H[(18 + 3 * i + j) * L + k] = -K;
            }
}

/* --- triangles: x [9][8], rest [7][8] = B row by row, area, mu, lambda ---
 * strain_n [3][8] (E11, E22, E12 at the step's start) and damp [8] come together or are both NULL.
 * f [9][8] is the gradient, H [6][9][8]. */

typedef struct clothi_tri {                 /* one lane */
    double f0, f1, f2, f3, f4, f5;          /* F, row-major [3x2]                                */
    double e0, e1, e2;                      /* E11, E22, E12                                     */
} clothi_tri;

CLOTHI_LANE clothi_tri clothi_tri_at(const double *x, const double *rest, int k) {
    enum { L = CLOTHI_LANES };
    const double b0 = rest[k], b1 = rest[L + k], b2 = rest[2 * L + k], b3 = rest[3 * L + k];
    const double d0 = x[3 * L + k] - x[k], d1 = x[4 * L + k] - x[L + k];
    const double d2 = x[5 * L + k] - x[2 * L + k], h0 = x[6 * L + k] - x[k];
    const double h1 = x[7 * L + k] - x[L + k], h2 = x[8 * L + k] - x[2 * L + k];
    clothi_tri   t;
    t.f0 = d0 * b0 + h0 * b2;
    t.f1 = d0 * b1 + h0 * b3;
    t.f2 = d1 * b0 + h1 * b2;
    t.f3 = d1 * b1 + h1 * b3;
    t.f4 = d2 * b0 + h2 * b2;
    t.f5 = d2 * b1 + h2 * b3;
    t.e0 = 0.5 * (t.f0 * t.f0 + t.f2 * t.f2 + t.f4 * t.f4 - 1.0);
    t.e1 = 0.5 * (t.f1 * t.f1 + t.f3 * t.f3 + t.f5 * t.f5 - 1.0);
    t.e2 = 0.5 * (t.f0 * t.f1 + t.f2 * t.f3 + t.f4 * t.f5);
    return t;
}

/* E + damp (E - E^n): the strain whose elastic stress is the whole stress. */
CLOTHI_LANE clothi_tri clothi_tri_damped(clothi_tri t, const double *strain_n, const double *damp,
                                         int k) {
    t.e0 += damp[k] * (t.e0 - strain_n[k]);
    t.e1 += damp[k] * (t.e1 - strain_n[CLOTHI_LANES + k]);
    t.e2 += damp[k] * (t.e2 - strain_n[2 * CLOTHI_LANES + k]);
    return t;
}

CLOTHI_LANE void clothi_tri_force(clothi_tri t, const double *rest, int k, double *f) {
    enum { L = CLOTHI_LANES };
    const double area = rest[4 * L + k], mu2 = 2.0 * rest[5 * L + k];
    const double tr = rest[6 * L + k] * (t.e0 + t.e1);
    const double s0 = area * (mu2 * t.e0 + tr), s1 = area * (mu2 * t.e1 + tr);
    const double s2 = area * (mu2 * t.e2);
    const double b0 = rest[k], b1 = rest[L + k], b2 = rest[2 * L + k], b3 = rest[3 * L + k];
    const double m0 = s0 * b0 + s2 * b1, m1 = s2 * b0 + s1 * b1;    /* A S g of corner 1 */
    const double n0 = s0 * b2 + s2 * b3, n1 = s2 * b2 + s1 * b3;    /* and of corner 2 */
    const double p0 = t.f0 * m0 + t.f1 * m1, p1 = t.f2 * m0 + t.f3 * m1;
    const double p2 = t.f4 * m0 + t.f5 * m1, q0 = t.f0 * n0 + t.f1 * n1;
    const double q1 = t.f2 * n0 + t.f3 * n1, q2 = t.f4 * n0 + t.f5 * n1;
    f[k] = -p0 - q0;
    f[L + k] = -p1 - q1;
    f[2 * L + k] = -p2 - q2;
    f[3 * L + k] = p0;
    f[4 * L + k] = p1;
    f[5 * L + k] = p2;
    f[6 * L + k] = q0;
    f[7 * L + k] = q1;
    f[8 * L + k] = q2;
}

/* A (mu |e|^2 + lambda/2 tr(e)^2) */
CLOTHI_LANE double clothi_tri_energy(double e0, double e1, double e2, const double *rest, int k) {
    enum { L = CLOTHI_LANES };
    return rest[4 * L + k] * (rest[5 * L + k] * (e0 * e0 + e1 * e1 + 2.0 * e2 * e2)
                              + 0.5 * rest[6 * L + k] * (e0 + e1) * (e0 + e1));
}

/* The explicit step's path: forces and nothing else. */
CLOTHI_HOT void clothi_stretch_forces(const double *CLOTHI_RESTRICT x,
                                      const double *CLOTHI_RESTRICT rest,
                                      double *CLOTHI_RESTRICT f) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) clothi_tri_force(clothi_tri_at(x, rest, k), rest, k, f);
}

CLOTHI_HOT void clothi_stretch_forces_damped(const double *CLOTHI_RESTRICT x,
                                             const double *CLOTHI_RESTRICT rest,
                                             const double *CLOTHI_RESTRICT strain_n,
                                             const double *CLOTHI_RESTRICT damp,
                                             double *CLOTHI_RESTRICT f) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++)
        clothi_tri_force(clothi_tri_damped(clothi_tri_at(x, rest, k), strain_n, damp, k), rest, k,
                         f);
}

/* strain [3][8]: E11, E22, E12 of x. What a step hands on as strain_n. */
CLOTHI_HOT void clothi_strain_lanes(const double *CLOTHI_RESTRICT x,
                                    const double *CLOTHI_RESTRICT rest,
                                    double *CLOTHI_RESTRICT strain) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        strain[k] = t.e0;
        strain[CLOTHI_LANES + k] = t.e1;
        strain[2 * CLOTHI_LANES + k] = t.e2;
    }
}

/* The squares of the smaller principal stretches, for reports: the smaller eigenvalue of F'F, good
 * to 1e-16 of the larger one. */
CLOTHI_HOT void clothi_smallest_stretch2(const double *CLOTHI_RESTRICT x,
                                         const double *CLOTHI_RESTRICT rest,
                                         double *CLOTHI_RESTRICT out) {
    double mean[CLOTHI_LANES], radius[CLOTHI_LANES];
    int    k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        mean[k] = 1.0 + t.e0 + t.e1;
        radius[k] = (t.e0 - t.e1) * (t.e0 - t.e1) + 4.0 * t.e2 * t.e2;
    }
    clothi_sqrt_lanes(radius);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const double s = mean[k] - radius[k];
        out[k] = 0.5 * (s + fabs(s));
    }
}

CLOTHI_HOT void clothi_stretch_energies(const double *CLOTHI_RESTRICT x,
                                        const double *CLOTHI_RESTRICT rest,
                                        double *CLOTHI_RESTRICT E) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        E[k] = clothi_tri_energy(t.e0, t.e1, t.e2, rest, k);
    }
}

CLOTHI_HOT void clothi_stretch_losses(const double *CLOTHI_RESTRICT x,
                                      const double *CLOTHI_RESTRICT rest,
                                      const double *CLOTHI_RESTRICT strain_n,
                                      const double *CLOTHI_RESTRICT damp,
                                      double *CLOTHI_RESTRICT Ed) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        Ed[k] = damp[k] * clothi_tri_energy(t.e0 - strain_n[k], t.e1 - strain_n[L + k],
                                            t.e2 - strain_n[2 * L + k], rest, k);
    }
}

/* What every Hessian block needs of a lane: q of corners 1 and 2, A mu F F', and the scalars. */
typedef struct clothi_tri_batch {
    double q[2][3][CLOTHI_LANES];
    double ff[6][CLOTHI_LANES];             /* A mu' F F': 00 11 22 10 20 21                     */
    double gg[3][CLOTHI_LANES];             /* g_i.g_j: 11 22 21                                 */
    double sg[3][CLOTHI_LANES];             /* A g_i' S g_j                                      */
    double mu[CLOTHI_LANES], lambda[CLOTHI_LANES];      /* A mu', A lambda'                      */
    double stress[3][CLOTHI_LANES], radius[CLOTHI_LANES];
} clothi_tri_batch;

/* mu' = (1 + damp) mu: the damping's material part. */
CLOTHI_HOT void clothi_stretch_prepare(const double *CLOTHI_RESTRICT x,
                                       const double *CLOTHI_RESTRICT rest,
                                       const double *CLOTHI_RESTRICT strain_n,
                                       const double *CLOTHI_RESTRICT damp,
                                       clothi_tri_batch *CLOTHI_RESTRICT w) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        const clothi_tri d = clothi_tri_damped(t, strain_n, damp, k);
        const double     area = rest[4 * L + k], mu = area * rest[5 * L + k];
        const double     lambda = area * rest[6 * L + k], tr = lambda * (d.e0 + d.e1);
        const double     b0 = rest[k], b1 = rest[L + k], b2 = rest[2 * L + k];
        const double     b3 = rest[3 * L + k], m = mu * (1.0 + damp[k]);
        const double     s0 = 2.0 * mu * d.e0 + tr, s1 = 2.0 * mu * d.e1 + tr;
        const double     s2 = 2.0 * mu * d.e2, half = 0.5 * (s0 - s1);
        w->mu[k] = m;
        w->lambda[k] = lambda * (1.0 + damp[k]);
        w->q[0][0][k] = t.f0 * b0 + t.f1 * b1;
        w->q[0][1][k] = t.f2 * b0 + t.f3 * b1;
        w->q[0][2][k] = t.f4 * b0 + t.f5 * b1;
        w->q[1][0][k] = t.f0 * b2 + t.f1 * b3;
        w->q[1][1][k] = t.f2 * b2 + t.f3 * b3;
        w->q[1][2][k] = t.f4 * b2 + t.f5 * b3;
        w->ff[0][k] = m * (t.f0 * t.f0 + t.f1 * t.f1);
        w->ff[1][k] = m * (t.f2 * t.f2 + t.f3 * t.f3);
        w->ff[2][k] = m * (t.f4 * t.f4 + t.f5 * t.f5);
        w->ff[3][k] = m * (t.f0 * t.f2 + t.f1 * t.f3);
        w->ff[4][k] = m * (t.f0 * t.f4 + t.f1 * t.f5);
        w->ff[5][k] = m * (t.f2 * t.f4 + t.f3 * t.f5);
        w->gg[0][k] = b0 * b0 + b1 * b1;
        w->gg[1][k] = b2 * b2 + b3 * b3;
        w->gg[2][k] = b0 * b2 + b1 * b3;
        w->stress[0][k] = s0;
        w->stress[1][k] = s1;
        w->stress[2][k] = s2;
        w->radius[k] = half * half + s2 * s2;
    }
}

CLOTHI_HOT void clothi_stretch_stress_part(const double *CLOTHI_RESTRICT rest,
                                           clothi_tri_batch *CLOTHI_RESTRICT w, int psd) {
    enum { L = CLOTHI_LANES };
    int k;
    if (psd) {                              /* [6.2]: S+ = a S + b I */
        clothi_sqrt_lanes(w->radius);
        for (k = 0; k < L; k++) {
            const double mean = 0.5 * (w->stress[0][k] + w->stress[1][k]), r = w->radius[k];
            const double up = mean + r, down = mean - r;
            const double hi = 0.5 * (up + fabs(up)), lo = 0.5 * (down + fabs(down));
            const double a = 0.5 * (hi - lo) / (r + 1e-300), b = 0.5 * (hi + lo) - a * mean;
            w->stress[0][k] = a * w->stress[0][k] + b;
            w->stress[1][k] = a * w->stress[1][k] + b;
            w->stress[2][k] = a * w->stress[2][k];
        }
    }
    for (k = 0; k < L; k++) {
        const double b0 = rest[k], b1 = rest[L + k], b2 = rest[2 * L + k], b3 = rest[3 * L + k];
        const double s0 = w->stress[0][k], s1 = w->stress[1][k], s2 = w->stress[2][k];
        w->sg[0][k] = s0 * b0 * b0 + s1 * b1 * b1 + 2.0 * s2 * b0 * b1;
        w->sg[1][k] = s0 * b2 * b2 + s1 * b3 * b3 + 2.0 * s2 * b2 * b3;
        w->sg[2][k] = s0 * b0 * b2 + s1 * b1 * b3 + s2 * (b0 * b3 + b1 * b2);
    }
}

/* Blocks 11, 22 and 21. */
CLOTHI_HOT void clothi_stretch_blocks(const clothi_tri_batch *CLOTHI_RESTRICT w,
                                      double *CLOTHI_RESTRICT H) {
    enum { L = CLOTHI_LANES };
    static const int packed[9] = {0, 3, 4, 3, 1, 5, 4, 5, 2};
    int              k, r, c;
    for (r = 0; r < 3; r++)
        for (c = 0; c < 3; c++) {
            const int     at = 3 * r + c;
            const double *ff = w->ff[packed[at]], *p0 = w->q[0][r], *p1 = w->q[1][r];
            const double *q0 = w->q[0][c], *q1 = w->q[1][c];
            const double  one = r == c ? 1.0 : 0.0;
            for (k = 0; k < L; k++) {
                const double ml = w->mu[k] + w->lambda[k];
                H[(9 + at) * L + k] = w->gg[0][k] * ff[k] + ml * (p0[k] * q0[k])
                                      + one * w->sg[0][k];
                H[(18 + at) * L + k] = w->gg[1][k] * ff[k] + ml * (p1[k] * q1[k])
                                       + one * w->sg[1][k];
                H[(45 + at) * L + k] = w->gg[2][k] * ff[k] + w->mu[k] * (p0[k] * q1[k])
                                       + w->lambda[k] * (p1[k] * q0[k]) + one * w->sg[2][k];
            }
        }
}

/* As clothi_hinge_close, for three corners. */
CLOTHI_HOT void clothi_stretch_close(const double *CLOTHI_RESTRICT from,
                                     double *CLOTHI_RESTRICT to) {
    enum { L = CLOTHI_LANES };
    int r, c, k;
    for (r = 0; r < 3; r++)
        for (c = 0; c < 3; c++) {
            const int     at = 3 * r + c, tr = 3 * c + r;
            const double *h11 = from + at * L, *h22 = from + (9 + at) * L;
            const double *h21 = from + (36 + at) * L, *h12 = from + (36 + tr) * L;
            double       *h00 = to + at * L, *h10 = to + (27 + at) * L, *h20 = to + (36 + at) * L;
            for (k = 0; k < L; k++) {
                h00[k] = (h11[k] + h22[k]) + (h21[k] + h12[k]);
                h10[k] = -(h11[k] + h12[k]);
                h20[k] = -(h22[k] + h21[k]);
            }
        }
}

CLOTHI_UNUSED static void clothi_stretch_lanes(const double *x, const double *rest,
                                               const double *strain_n, const double *damp,
                                               double *E, double *Ed, double *f, double *H,
                                               int psd) {
    static const double none[3 * CLOTHI_LANES] = {0};
    if (E) clothi_stretch_energies(x, rest, E);
    if (Ed) clothi_stretch_losses(x, rest, damp ? strain_n : none, damp ? damp : none, Ed);
    if (f && damp) clothi_stretch_forces_damped(x, rest, strain_n, damp, f);
    if (f && !damp) clothi_stretch_forces(x, rest, f);
    if (H) {
        clothi_tri_batch w;
        clothi_stretch_prepare(x, rest, damp ? strain_n : none, damp ? damp : none, &w);
        clothi_stretch_stress_part(rest, &w, psd);
        clothi_stretch_blocks(&w, H);
        clothi_stretch_close(H + 9 * CLOTHI_LANES, H);
    }
}

/* --- hinges: x [12][8], rest [2][8] = c, theta0 ---
 * theta_n [8] and damp [8] come together or are both NULL. f [12][8], H [10][9][8]. */

typedef struct clothi_fold {                /* one lane */
    double e0, e1, e2, a0, a1, a2, b0, b1, b2;
    double n0, n1, n2, m0, m1, m2;          /* normals of the left and right wing                */
    double l2, ae, be, sine, cosine;
} clothi_fold;

CLOTHI_LANE clothi_fold clothi_fold_at(const double *x, const double *l, int k) {
    enum { L = CLOTHI_LANES };
    clothi_fold h;
    h.e0 = x[3 * L + k] - x[k];
    h.e1 = x[4 * L + k] - x[L + k];
    h.e2 = x[5 * L + k] - x[2 * L + k];
    h.a0 = x[6 * L + k] - x[k];
    h.a1 = x[7 * L + k] - x[L + k];
    h.a2 = x[8 * L + k] - x[2 * L + k];
    h.b0 = x[9 * L + k] - x[k];
    h.b1 = x[10 * L + k] - x[L + k];
    h.b2 = x[11 * L + k] - x[2 * L + k];
    h.n0 = h.e1 * h.a2 - h.e2 * h.a1;
    h.n1 = h.e2 * h.a0 - h.e0 * h.a2;
    h.n2 = h.e0 * h.a1 - h.e1 * h.a0;
    h.m0 = h.b1 * h.e2 - h.b2 * h.e1;
    h.m1 = h.b2 * h.e0 - h.b0 * h.e2;
    h.m2 = h.b0 * h.e1 - h.b1 * h.e0;
    h.l2 = h.e0 * h.e0 + h.e1 * h.e1 + h.e2 * h.e2;
    h.ae = h.a0 * h.e0 + h.a1 * h.e1 + h.a2 * h.e2;
    h.be = h.b0 * h.e0 + h.b1 * h.e1 + h.b2 * h.e2;
    h.sine = -l[k] * (h.n0 * h.b0 + h.n1 * h.b1 + h.n2 * h.b2);
    h.cosine = h.n0 * h.m0 + h.n1 * h.m1 + h.n2 * h.m2;
    return h;
}

/* 1/l^2, 1/|n1|^2, 1/|n2|^2 with the floors of [6.3] */
typedef struct clothi_fold_inverse {
    double l2, q1, q2;                      /* the inverses                                      */
    double l2c, q1c, q2c;                   /* what they are inverses of                         */
    double q1r, q2r;                        /* |n|^2 times the inverse: 1 above the floor        */
} clothi_fold_inverse;

CLOTHI_LANE clothi_fold_inverse clothi_fold_invert(const clothi_fold *h) {
    const double s = h->l2 + (h->a0 * h->a0 + h->a1 * h->a1 + h->a2 * h->a2)
                     + (h->b0 * h->b0 + h->b1 * h->b1 + h->b2 * h->b2);
    const double lf = CLOTHI_HINGE_FLOOR * s + CLOTHI_HINGE_TINY_L2;
    const double qf = CLOTHI_HINGE_FLOOR * s * s + CLOTHI_HINGE_TINY_Q;
    const double q1 = h->n0 * h->n0 + h->n1 * h->n1 + h->n2 * h->n2;
    const double q2 = h->m0 * h->m0 + h->m1 * h->m1 + h->m2 * h->m2;
    clothi_fold_inverse v;
    double              q12, inv, invl;
    v.l2c = h->l2 > lf ? h->l2 : lf;
    v.q1c = q1 > qf ? q1 : qf;
    v.q2c = q2 > qf ? q2 : qf;
    q12 = v.q1c * v.q2c;
    inv = 1.0 / (v.l2c * q12);
    invl = inv * v.l2c;
    v.l2 = inv * q12;
    v.q1 = invl * v.q2c;
    v.q2 = invl * v.q1c;
    v.q1r = q1 * v.q1;
    v.q2r = q2 * v.q2;
    return v;
}

CLOTHI_LANE void clothi_fold_force(const clothi_fold *h, double l, double moment, int k,
                                   double *f) {
    enum { L = CLOTHI_LANES };
    const clothi_fold_inverse v = clothi_fold_invert(h);
    const double t1 = h->ae * v.l2, t2 = h->be * v.l2, ml = moment * l;
    const double k1 = ml * v.q1, k2 = ml * v.q2;
    const double p0 = k1 * h->n0, p1 = k1 * h->n1, p2 = k1 * h->n2;
    const double r0 = k2 * h->m0, r1 = k2 * h->m1, r2 = k2 * h->m2;
    const double g0 = t1 * p0 + t2 * r0, g1 = t1 * p1 + t2 * r1, g2 = t1 * p2 + t2 * r2;
    f[k] = p0 + r0 - g0;
    f[L + k] = p1 + r1 - g1;
    f[2 * L + k] = p2 + r2 - g2;
    f[3 * L + k] = g0;
    f[4 * L + k] = g1;
    f[5 * L + k] = g2;
    f[6 * L + k] = -p0;
    f[7 * L + k] = -p1;
    f[8 * L + k] = -p2;
    f[9 * L + k] = -r0;
    f[10 * L + k] = -r1;
    f[11 * L + k] = -r2;
}

CLOTHI_HOT void clothi_edge_lengths(const double *CLOTHI_RESTRICT x,
                                    double *CLOTHI_RESTRICT l) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const double d0 = x[3 * L + k] - x[k], d1 = x[4 * L + k] - x[L + k];
        const double d2 = x[5 * L + k] - x[2 * L + k];
        l[k] = d0 * d0 + d1 * d1 + d2 * d2;
    }
    clothi_sqrt_lanes(l);
}

CLOTHI_HOT void clothi_theta_lanes(const double *CLOTHI_RESTRICT x,
                                   double *CLOTHI_RESTRICT theta) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_edge_lengths(x, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        theta[k] = clothi_atan2(h.sine, h.cosine);
    }
}

/* The explicit step's path: forces and nothing else. */
CLOTHI_HOT void clothi_hinge_forces(const double *CLOTHI_RESTRICT x,
                                    const double *CLOTHI_RESTRICT rest,
                                    double *CLOTHI_RESTRICT f) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_edge_lengths(x, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        const double      bent = clothi_atan2(h.sine, h.cosine) - rest[CLOTHI_LANES + k];
        clothi_fold_force(&h, l[k], rest[k] * bent, k, f);
    }
}

/* With damping; theta [8] of x is handed out for the next step's theta_n. */
CLOTHI_HOT void clothi_hinge_forces_damped(const double *CLOTHI_RESTRICT x,
                                           const double *CLOTHI_RESTRICT rest,
                                           const double *CLOTHI_RESTRICT theta_n,
                                           const double *CLOTHI_RESTRICT damp,
                                           double *CLOTHI_RESTRICT theta,
                                           double *CLOTHI_RESTRICT f) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_edge_lengths(x, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        const double      angle = clothi_atan2(h.sine, h.cosine);
        const double      bent = angle - rest[CLOTHI_LANES + k];
        theta[k] = angle;
        clothi_fold_force(&h, l[k], rest[k] * (bent + damp[k] * (angle - theta_n[k])), k, f);
    }
}

/* dJ/dtheta of elastic and damping part, and the energies; from the angles. */
CLOTHI_HOT void clothi_hinge_moments(const double *CLOTHI_RESTRICT theta,
                                     const double *CLOTHI_RESTRICT rest,
                                     const double *CLOTHI_RESTRICT theta_n,
                                     const double *CLOTHI_RESTRICT damp,
                                     double *CLOTHI_RESTRICT moment,
                                     double *CLOTHI_RESTRICT E,
                                     double *CLOTHI_RESTRICT Ed) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const double bent = theta[k] - rest[CLOTHI_LANES + k], turned = theta[k] - theta_n[k];
        moment[k] = rest[k] * (bent + damp[k] * turned);
        E[k] = 0.5 * rest[k] * bent * bent;
        Ed[k] = 0.5 * rest[k] * damp[k] * turned * turned;
    }
}

CLOTHI_HOT void clothi_hinge_turn(const double *CLOTHI_RESTRICT x,
                                  const double *CLOTHI_RESTRICT moment,
                                  double *CLOTHI_RESTRICT f) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_edge_lengths(x, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        clothi_fold_force(&h, l[k], moment[k], k, f);
    }
}

/* Per wing and lane: p, z of corner 1 and of the wing's corner, (h/l)^2/2 M, foot. */
typedef struct clothi_fold_batch {
    double p[2][3][CLOTHI_LANES], z1[2][3][CLOTHI_LANES], z2[2][3][CLOTHI_LANES];
    double km[2][3][CLOTHI_LANES], t[2][CLOTHI_LANES], g[3][3][CLOTHI_LANES];
} clothi_fold_batch;

CLOTHI_HOT void clothi_hinge_prepare(const double *CLOTHI_RESTRICT x,
                                     clothi_fold_batch *CLOTHI_RESTRICT w) {
    enum { L = CLOTHI_LANES };
    double l[L], e[3][L], il[L], c1[L], c2[L], k1[L], k2[L], m1[L], m2[L];
    int    k, r;
    clothi_edge_lengths(x, l);
    for (k = 0; k < L; k++) {
        const clothi_fold         h = clothi_fold_at(x, l, k);
        const clothi_fold_inverse v = clothi_fold_invert(&h);
        e[0][k] = h.e0;
        e[1][k] = h.e1;
        e[2][k] = h.e2;
        w->t[0][k] = h.ae * v.l2;
        w->t[1][k] = h.be * v.l2;
        il[k] = v.l2;
        c1[k] = l[k] * v.q1;
        c2[k] = l[k] * v.q2;
        m1[k] = v.l2c * v.q1;
        m2[k] = v.l2c * v.q2;
        k1[k] = 0.5 * v.q1r * v.l2;
        k2[k] = 0.5 * v.q2r * v.l2;
        w->p[0][0][k] = h.n0 * c1[k];
        w->p[0][1][k] = h.n1 * c1[k];
        w->p[0][2][k] = h.n2 * c1[k];
        w->p[1][0][k] = h.m0 * c2[k];
        w->p[1][1][k] = h.m1 * c2[k];
        w->p[1][2][k] = h.m2 * c2[k];
    }
    for (r = 0; r < 3; r++)
        for (k = 0; k < L; k++) {
            const double h1 = x[(6 + r) * L + k] - x[r * L + k] - w->t[0][k] * e[r][k];
            const double h2 = x[(9 + r) * L + k] - x[r * L + k] - w->t[1][k] * e[r][k];
            const double edge = e[r][k] * il[k], p1 = w->p[0][r][k], p2 = w->p[1][r][k];
            w->z2[0][r][k] = h1 * m1[k];
            w->z2[1][r][k] = h2 * m2[k];
            w->z1[0][r][k] = edge - w->t[0][k] * (h1 * m1[k]);
            w->z1[1][r][k] = edge - w->t[1][k] * (h2 * m2[k]);
            w->km[0][r][k] = k1[k] * h1;
            w->km[1][r][k] = k2[k] * h2;
            w->g[0][r][k] = w->t[0][k] * p1 + w->t[1][k] * p2;      /* dtheta/dx1 */
            w->g[1][r][k] = -p1;
            w->g[2][r][k] = -p2;
        }
}

CLOTHI_HOT void clothi_hinge_spread(const clothi_fold_batch *CLOTHI_RESTRICT w,
                                    const double *CLOTHI_RESTRICT moment,
                                    double *CLOTHI_RESTRICT f) {
    enum { L = CLOTHI_LANES };
    int r, k;
    for (r = 0; r < 3; r++)
        for (k = 0; k < L; k++) {
            const double m = moment[k], g1 = w->g[0][r][k], g2 = w->g[1][r][k];
            const double g3 = w->g[2][r][k];
            f[r * L + k] = -m * (g1 + g2 + g3);
            f[(3 + r) * L + k] = m * g1;
            f[(6 + r) * L + k] = m * g2;
            f[(9 + r) * L + k] = m * g3;
        }
}

/* Blocks among the corners 1, 2, 3: square times g g', and moment times the second derivative. */
CLOTHI_HOT void clothi_hinge_square(const clothi_fold_batch *CLOTHI_RESTRICT w,
                                    const double *CLOTHI_RESTRICT square,
                                    double *CLOTHI_RESTRICT H) {
    enum { L = CLOTHI_LANES };
    static const int block[6][3] = {            /* its number, row and column in g */
        {1, 0, 0}, {2, 1, 1}, {3, 2, 2}, {6, 1, 0}, {8, 2, 0}, {9, 2, 1}};
    int              b, r, c, k;
    for (b = 0; b < 6; b++)
        for (r = 0; r < 3; r++)
            for (c = 0; c < 3; c++) {
                const double *CLOTHI_RESTRICT g = w->g[block[b][1]][r];
                const double *CLOTHI_RESTRICT q = w->g[block[b][2]][c];
                double *CLOTHI_RESTRICT       out = H + (9 * block[b][0] + 3 * r + c) * L;
                for (k = 0; k < L; k++) out[k] = square[k] * (g[k] * q[k]);
            }
}

CLOTHI_HOT void clothi_hinge_curve(const clothi_fold_batch *CLOTHI_RESTRICT w,
                                   const double *CLOTHI_RESTRICT moment,
                                   double *CLOTHI_RESTRICT H) {
    enum { L = CLOTHI_LANES };
    int s, r, c, k;
    for (s = 0; s < 2; s++)
        for (r = 0; r < 3; r++)
            for (c = 0; c < 3; c++) {
                const double *CLOTHI_RESTRICT p = w->p[s][r], *CLOTHI_RESTRICT q = w->p[s][c];
                const double *CLOTHI_RESTRICT zr = w->z1[s][r], *CLOTHI_RESTRICT zc = w->z1[s][c];
                const double *CLOTHI_RESTRICT yr = w->z2[s][r], *CLOTHI_RESTRICT yc = w->z2[s][c];
                const double *CLOTHI_RESTRICT kr = w->km[s][r], *CLOTHI_RESTRICT kc = w->km[s][c];
                const double *CLOTHI_RESTRICT t = w->t[s];
                double *CLOTHI_RESTRICT       h11 = H + (9 + 3 * r + c) * L;
                double *CLOTHI_RESTRICT       h22 = H + (9 * (2 + s) + 3 * r + c) * L;
                double *CLOTHI_RESTRICT       h21 = H + (9 * (s ? 8 : 6) + 3 * r + c) * L;
                for (k = 0; k < L; k++) {
                    const double m = moment[k];
                    h22[k] += m * (p[k] * yc[k] + yr[k] * q[k]);
                    h21[k] += m * (zr[k] * q[k] - t[k] * (p[k] * yc[k]));
                    h11[k] += m * (p[k] * (kc[k] - t[k] * zc[k]) + (kr[k] - t[k] * zr[k]) * q[k]);
                }
            }
}

/* The blocks of corner 0 by the vanishing sums: from = block 11 of the array that `to` begins. Two
 * pointers, because what is read and what is written do not overlap. */
CLOTHI_HOT void clothi_hinge_close(const double *CLOTHI_RESTRICT from, double *CLOTHI_RESTRICT to) {
    enum { L = CLOTHI_LANES };
    int r, c, k;
    for (r = 0; r < 3; r++)
        for (c = 0; c < 3; c++) {
            const int     at = 3 * r + c, tr = 3 * c + r;
            const double *h11 = from + at * L, *h22 = from + (9 + at) * L;
            const double *h33 = from + (18 + at) * L, *h21 = from + (45 + at) * L;
            const double *h12 = from + (45 + tr) * L, *h31 = from + (63 + at) * L;
            const double *h13 = from + (63 + tr) * L, *h32 = from + (72 + at) * L;
            const double *h23 = from + (72 + tr) * L;
            double       *h00 = to + at * L, *h10 = to + (36 + at) * L;
            double       *h20 = to + (45 + at) * L, *h30 = to + (63 + at) * L;
            for (k = 0; k < L; k++) {
                h00[k] = (h11[k] + h22[k] + h33[k])
                         + ((h21[k] + h12[k]) + (h31[k] + h13[k]) + (h32[k] + h23[k]));
                h10[k] = -(h11[k] + h12[k] + h13[k]);
                h20[k] = -(h22[k] + h21[k] + h23[k]);
                h30[k] = -(h33[k] + h31[k] + h32[k]);
            }
        }
}

CLOTHI_UNUSED static void clothi_hinge_lanes(const double *x, const double *rest,
                                             const double *theta_n, const double *damp, double *E,
                                             double *Ed, double *theta_out, double *f, double *H,
                                             int psd) {
    static const double none[CLOTHI_LANES] = {0};
    double              theta[CLOTHI_LANES], moment[CLOTHI_LANES], square[CLOTHI_LANES];
    double              e[CLOTHI_LANES], ed[CLOTHI_LANES];
    int                 k;
    clothi_theta_lanes(x, theta);
    clothi_hinge_moments(theta, rest, damp ? theta_n : none, damp ? damp : none, moment, e, ed);
    if (theta_out) memcpy(theta_out, theta, sizeof theta);
    if (E) memcpy(E, e, sizeof e);
    if (Ed) memcpy(Ed, ed, sizeof ed);
    if (f && !H) clothi_hinge_turn(x, moment, f);
    if (H) {
        clothi_fold_batch w;
        for (k = 0; k < CLOTHI_LANES; k++) square[k] = rest[k] * (damp ? 1.0 + damp[k] : 1.0);
        clothi_hinge_prepare(x, &w);
        if (f) clothi_hinge_spread(&w, moment, f);
        clothi_hinge_square(&w, square, H);
        if (!psd) clothi_hinge_curve(&w, moment, H);
        clothi_hinge_close(H + 9 * CLOTHI_LANES, H);
    }
}

/* --- quadratic bending: x [12][8], rest [5][8] = c, w0 .. w3 --- */

CLOTHI_HOT void clothi_quadratic_forces(const double *CLOTHI_RESTRICT x,
                                        const double *CLOTHI_RESTRICT rest,
                                        double *CLOTHI_RESTRICT f) {
    enum { L = CLOTHI_LANES };
    int r, k;
    for (r = 0; r < 3; r++)
        for (k = 0; k < L; k++) {
            const double x0 = x[r * L + k];
            const double s = rest[k] * (rest[2 * L + k] * (x[(3 + r) * L + k] - x0)
                                        + rest[3 * L + k] * (x[(6 + r) * L + k] - x0)
                                        + rest[4 * L + k] * (x[(9 + r) * L + k] - x0));
            f[r * L + k] = rest[L + k] * s;
            f[(3 + r) * L + k] = rest[2 * L + k] * s;
            f[(6 + r) * L + k] = rest[3 * L + k] * s;
            f[(9 + r) * L + k] = rest[4 * L + k] * s;
        }
}

CLOTHI_HOT void clothi_quadratic_energies(const double *CLOTHI_RESTRICT x,
                                          const double *CLOTHI_RESTRICT rest,
                                          double *CLOTHI_RESTRICT E) {
    enum { L = CLOTHI_LANES };
    int r, k;
    for (k = 0; k < L; k++) E[k] = 0.0;
    for (r = 0; r < 3; r++)
        for (k = 0; k < L; k++) {
            const double x0 = x[r * L + k];
            const double s = rest[2 * L + k] * (x[(3 + r) * L + k] - x0)
                             + rest[3 * L + k] * (x[(6 + r) * L + k] - x0)
                             + rest[4 * L + k] * (x[(9 + r) * L + k] - x0);
            E[k] += 0.5 * rest[k] * s * s;
        }
}

CLOTHI_UNUSED static void clothi_quadratic_lanes(const double *x, const double *rest, double *E,
                                                 double *f) {
    if (E) clothi_quadratic_energies(x, rest, E);
    if (f) clothi_quadratic_forces(x, rest, f);
}

/* ===== [7.1] ORDERING ======================================================================== */

/* ===== [7.2] BLOCK SPARSE MATRIX ============================================================= */

/* ===== [7.3] CONJUGATE GRADIENTS ============================================================= */

/* ===== [7.4] SPARSE CHOLESKY ================================================================= */

/* ===== [8.1] MODEL =========================================================================== */

/* ===== [8.2] SIM ============================================================================= */

/* ===== [9.1] ENERGY TERMS ==================================================================== */

/* ===== [9.2] NEWTON ========================================================================== */

/* ===== [9.3] IMPLICIT STEPS AND STATICS ====================================================== */

/* ===== [9.4] LEAPFROG ======================================================================== */

/* ===== [9.5] THE STEP ======================================================================== */

/* ===== [10.1] RUN-TIME CONTROL =============================================================== */

/* ===== [10.2] SNAPSHOT ======================================================================= */

/* ===== [10.3] QUERIES ======================================================================== */

/* ===== [10.4] ADVICE ========================================================================= */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */

/* ===== [11.1] CHANGES AND LICENCE ============================================================
 * 0.1.0  first version.
 */
