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

/* Most vertices and most faces that a mesh may have: 12 times it still fits an int. */
#define CLOTH_MAX_COUNT (0x7fffffff / 12)

/* --- mesh: topology --- */

/* Who is beside whom on a triangle mesh. Read only; made by cloth_topology_create, one block.
 * Half-edge h = 3 f + k runs from corner k to corner k+1 (mod 3) of face f.                   */
typedef struct cloth_topology {
    int  nv, nf;        /* vertices, faces                                                     */
    int  ne, nh;        /* edges, hinges (edges with two faces)                                */
    int  nloop;         /* boundary loops                                                      */
    int *edges;         /* [ne x 2] vertices a < b; sorted by a, then by b                     */
    int *edge_faces;    /* [ne x 2] hinge: left (runs a -> b) and right face; boundary: its
                           face whichever way it runs, then -1                                 */
    int *face_edges;    /* [nf x 3] edge of half-edge 3 f + k                                  */
    int *hinges;        /* [nh x 4] a, b, corner of the left face, corner of the right face:
                           the vertices of cloth_bend and cloth_dihedral; in order of edges    */
    int *hinge_edge;    /* [nh]     index into edges, increasing                               */
    int *hinge_faces;   /* [nh x 2] left, right                                                */
    int *loop_start;    /* [nloop + 1] ranges of loop_vertex                                   */
    int *loop_vertex;   /* vertices along each loop with the surface on the left, from the
                           loop's smallest vertex; loops in order of that vertex               */
    int *vf_start;      /* [nv + 1] ranges of vf                                               */
    int *vf;            /* [3 nf]   faces around each vertex, increasing                       */
    int *vv_start;      /* [nv + 1] ranges of vv                                               */
    int *vv;            /* [2 ne]   neighbours of each vertex, increasing                      */
} cloth_topology;

/* ===== [2.4] EVERYDAY (tier 1) =============================================================== */

/* CLOTH_VERSION_NUM of the compiled implementation; compare with the macro of your header. */
CLOTH_API int cloth_version(void);

/* ===== [2.5] CONTROL (tier 2) ================================================================ */

/* ===== [2.6] BUILDING BLOCKS (tier 3) ======================================================== */

/* --- mesh: topology --- */

/* Edges, hinges, boundary loops and incidence of the faces.                            [4.2]
 * in   hooks  NULL: malloc, silent
 * in   faces  [nf x 3] vertices, counter-clockwise seen from the side the normals point to
 * out  *out   owned: cloth_topology_destroy with the same hooks; NULL on failure
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: NULL, negative or more than CLOTH_MAX_COUNT vertices or
 *   faces; CLOTH_ERR_MEMORY; CLOTH_ERR_MESH (the sentence names the first fault; cloth_mesh_check
 *   names all): index out of range, repeated corner, edge with three faces, two faces that run
 *   along an edge in one direction, the same three corners twice.
 *   Isolated vertices and bow-ties are accepted.
 * contract: alloc one block and scratch | cost O(nv + nf), counting sorts | deterministic */
CLOTH_API cloth_status cloth_topology_create(const cloth_hooks *hooks, int nv, int nf,
                                             const int *faces, cloth_topology **out);
CLOTH_API void cloth_topology_destroy(const cloth_hooks *hooks, cloth_topology *topology);

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

static int clothi_halfedge_next(int h) { return h % 3 == 2 ? h - 2 : h + 1; }

/* out = the items of `in` (NULL: 0, 1, 2, ...) sorted by key[item] in [0, nkeys), equal keys in
 * the order of `in`. count [nkeys + 1] is scratch. The sort of a whole record is one call per
 * field, the least important first. */
static void clothi_sort_by(int n, int nkeys, const int *key, const int *in, int *out,
                           int *count) {
    int i;
    memset(count, 0, ((size_t)nkeys + 1u) * sizeof *count);
    for (i = 0; i < n; i++) count[key[i] + 1]++;
    for (i = 0; i < nkeys; i++) count[i + 1] += count[i];
    for (i = 0; i < n; i++) {
        int item = in ? in[i] : i;
        out[count[key[item]]++] = item;
    }
}

/* Half-edges sorted by their vertices (smaller, larger), then by number. */
typedef struct clothi_edge_sort {
    int *lo, *hi;       /* [3 nf] smaller and larger end of each half-edge                     */
    int *order;         /* [3 nf] half-edges; those of one edge stand together                 */
    int *work;          /* [3 nf] scratch                                                      */
    int *count;         /* [nv + 1] scratch                                                    */
} clothi_edge_sort;

static void clothi_edge_sort_free(const cloth_hooks *hooks, clothi_edge_sort *s) {
    clothi_free(hooks, s->lo);
    clothi_free(hooks, s->count);
    memset(s, 0, sizeof *s);
}

/* Every index of faces is in [0, nv). */
static cloth_status clothi_edge_sort_make(const cloth_hooks *hooks, int nv, int nf,
                                          const int *faces, clothi_edge_sort *s) {
    const size_t n = 3 * (size_t)nf;
    int h;
    s->lo = (int *)clothi_alloc(hooks, 4 * n, sizeof(int));
    s->count = (int *)clothi_alloc(hooks, (size_t)nv + 1u, sizeof(int));
    if (!s->lo || !s->count) {
        clothi_edge_sort_free(hooks, s);
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to sort the edges of %i faces", nf);
    }
    s->hi = s->lo + n;
    s->order = s->hi + n;
    s->work = s->order + n;
    for (h = 0; h < 3 * nf; h++) {
        int a = faces[h], b = faces[clothi_halfedge_next(h)];
        s->lo[h] = a < b ? a : b;
        s->hi[h] = a < b ? b : a;
    }
    clothi_sort_by(3 * nf, nv, s->hi, NULL, s->work, s->count);
    clothi_sort_by(3 * nf, nv, s->lo, s->work, s->order, s->count);
    return CLOTH_OK;
}

/* End of the run of half-edges order[i ..] that lie on one edge. */
static int clothi_edge_run(const clothi_edge_sort *s, int n, int i) {
    const int h = s->order[i];
    do i++;
    while (i < n && s->lo[s->order[i]] == s->lo[h] && s->hi[s->order[i]] == s->hi[h]);
    return i;
}

static cloth_status clothi_check_counts(const cloth_hooks *hooks, int nv, int nf) {
    if (nv < 0 || nv > CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "nv = %i is outside 0 .. %i", nv,
                           CLOTH_MAX_COUNT);
    if (nf < 0 || nf > CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "nf = %i is outside 0 .. %i", nf,
                           CLOTH_MAX_COUNT);
    return CLOTH_OK;
}

/* ===== [4.2] TOPOLOGY ==========================================================================
 *            x2 = c             A hinge is an edge with two faces. Its four vertices stand in
 *           /  \                the order that cloth_bend wants: the edge's ends as the LEFT
 *    left  /    \               face runs along it, the left face's corner, the right one's:
 *         / (n1) \                 left face  (x0, x1, x2)   n1 = e x (x2 - x0)
 *  x0 = a ---e----> b = x1         right face (x1, x0, x3)   n2 = (x3 - x0) x e,  e = x1 - x0
 *         \ (n2) /              so that n1 and n2 are the normals of the faces as wound.
 *   right  \    /               We take a < b; of two faces that are wound alike exactly one
 *           \  /                runs a -> b: the left one.
 *            x3 = d
 *
 * Edges are found by sorting the 3 nf half-edges by (smaller, larger vertex): two counting
 * sorts, O(nv + nf), the same answer on every machine, and no worse when a million faces share
 * a vertex.
 * Boundary loops: behind a boundary half-edge a -> b the boundary goes on from b along the last
 * face of the same fan. Turning about b face by face finds it, and keeps two fans that touch in
 * one vertex (a bow-tie) apart, which a table 'next boundary vertex' would not.
 * checked: tests/test_mesh.c */

/* The first face that cannot be used at all. */
static cloth_status clothi_check_faces(const cloth_hooks *hooks, int nv, int nf,
                                       const int *faces) {
    int f, k;
    for (f = 0; f < nf; f++) {
        const int *t = faces + 3 * f;
        for (k = 0; k < 3; k++)
            if (t[k] < 0 || t[k] >= nv)
                return clothi_fail(hooks, CLOTH_ERR_MESH, "faces[%i] corner %i = %i but nv = %i",
                                   f, k, t[k], nv);
        if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0])
            return clothi_fail(hooks, CLOTH_ERR_MESH, "faces[%i] = %i %i %i repeats a corner", f,
                               t[0], t[1], t[2]);
    }
    return CLOTH_OK;
}

/* Counts edges, hinges and boundary edges, or refuses the first edge that is none of them. */
static cloth_status clothi_count_edges(const cloth_hooks *hooks, int nf, const int *faces,
                                       const clothi_edge_sort *s, int *ne, int *nh) {
    int i, end;
    *ne = *nh = 0;
    for (i = 0; i < 3 * nf; i = end) {
        const int g = s->order[i], h = i + 1 < 3 * nf ? s->order[i + 1] : 0;
        end = clothi_edge_run(s, 3 * nf, i);
        if (end - i > 2)
            return clothi_fail(hooks, CLOTH_ERR_MESH,
                               "edge %i-%i has %i faces, among them %i, %i and %i: at most 2",
                               s->lo[g], s->hi[g], end - i, g / 3, h / 3, s->order[i + 2] / 3);
        ++*ne;
        if (end - i == 1) continue;
        ++*nh;
        if (faces[g] == faces[h])
            return clothi_fail(hooks, CLOTH_ERR_MESH, "faces %i and %i both run %i -> %i: reverse"
                               " one of them", g / 3, h / 3, faces[g],
                               faces[clothi_halfedge_next(g)]);
        if (faces[clothi_halfedge_next(clothi_halfedge_next(g))] ==
            faces[clothi_halfedge_next(clothi_halfedge_next(h))])
            return clothi_fail(hooks, CLOTH_ERR_MESH, "faces %i and %i have the same corners:"
                               " remove one of them", g / 3, h / 3);
    }
    return CLOTH_OK;
}

/* The struct and its arrays in one block. Loops: at most one vertex per boundary edge and at
 * least three edges per loop. */
static cloth_topology *clothi_topology_alloc(const cloth_hooks *hooks, int nv, int nf, int ne,
                                             int nh) {
    const size_t head = (sizeof(cloth_topology) + sizeof(int) - 1u) / sizeof(int);
    const size_t v = (size_t)nv + 1u, f = (size_t)nf, e = (size_t)ne, h = (size_t)nh;
    const size_t b = e - h;
    cloth_topology *t;
    int *next = (int *)clothi_alloc(hooks, head + 2 * v + 6 * f + 6 * e + 7 * h + b + b / 3 + 1u,
                                    sizeof(int));
    if (!next) return NULL;
    t = (cloth_topology *)(void *)next;
    t->nv = nv;
    t->nf = nf;
    t->ne = ne;
    t->nh = nh;
    next += head;
    t->edges = next;       next += 2 * e;
    t->edge_faces = next;  next += 2 * e;
    t->face_edges = next;  next += 3 * f;
    t->hinges = next;      next += 4 * h;
    t->hinge_edge = next;  next += h;
    t->hinge_faces = next; next += 2 * h;
    t->loop_start = next;  next += b / 3 + 1u;
    t->loop_vertex = next; next += b;
    t->vf_start = next;    next += v;
    t->vf = next;          next += 3 * f;
    t->vv_start = next;    next += v;
    t->vv = next;
    return t;
}

static void clothi_topology_edges(const int *faces, const clothi_edge_sort *s,
                                  cloth_topology *t) {
    int i, end, e = 0, j = 0;
    for (i = 0; i < 3 * t->nf; i = end, e++) {
        int left = s->order[i], right;
        end = clothi_edge_run(s, 3 * t->nf, i);
        t->edges[2 * e] = s->lo[left];
        t->edges[2 * e + 1] = s->hi[left];
        t->edge_faces[2 * e] = left / 3;
        t->edge_faces[2 * e + 1] = -1;
        t->face_edges[left] = e;
        if (end - i == 1) continue;
        right = s->order[i + 1];
        t->face_edges[right] = e;
        if (faces[left] != t->edges[2 * e]) {
            left = right;
            right = s->order[i];
        }
        t->edge_faces[2 * e] = left / 3;
        t->edge_faces[2 * e + 1] = right / 3;
        t->hinges[4 * j] = t->edges[2 * e];
        t->hinges[4 * j + 1] = t->edges[2 * e + 1];
        t->hinges[4 * j + 2] = faces[clothi_halfedge_next(clothi_halfedge_next(left))];
        t->hinges[4 * j + 3] = faces[clothi_halfedge_next(clothi_halfedge_next(right))];
        t->hinge_edge[j] = e;
        t->hinge_faces[2 * j] = left / 3;
        t->hinge_faces[2 * j + 1] = right / 3;
        j++;
    }
}

/* The half-edge of face f on edge e. */
static int clothi_halfedge_on(const cloth_topology *t, int f, int e) {
    return t->face_edges[3 * f] == e ? 3 * f : t->face_edges[3 * f + 1] == e ? 3 * f + 1
                                                                            : 3 * f + 2;
}

/* The boundary half-edge that goes on from the end of boundary half-edge h. */
static int clothi_boundary_next(const cloth_topology *t, int h) {
    for (h = clothi_halfedge_next(h);; h = clothi_halfedge_next(h)) {
        const int e = t->face_edges[h], *ef = t->edge_faces + 2 * e;
        if (ef[1] < 0) return h;
        h = clothi_halfedge_on(t, ef[0] == h / 3 ? ef[1] : ef[0], e);
    }
}

/* seen [ne] is scratch, zeroed. */
static void clothi_topology_loops(const int *faces, cloth_topology *t, int *seen) {
    int e, n = 0;
    for (e = 0; e < t->ne; e++) {
        int h, first;
        if (t->edge_faces[2 * e + 1] >= 0 || seen[e]) continue;
        first = clothi_halfedge_on(t, t->edge_faces[2 * e], e);
        if (faces[first] != t->edges[2 * e]) first = clothi_boundary_next(t, first);
        h = first;
        do {
            seen[t->face_edges[h]] = 1;
            t->loop_vertex[n++] = faces[h];
            h = clothi_boundary_next(t, h);
        } while (h != first);
        t->loop_start[++t->nloop] = n;
    }
}

/* start [nv + 1] from the number of items that each vertex has, in start[vertex + 1]; and back
 * to the starts after filling has advanced start[vertex] to its end. */
static void clothi_csr_starts(int nv, int *start) {
    int v;
    for (v = 0; v < nv; v++) start[v + 1] += start[v];
}

static void clothi_csr_rewind(int nv, int *start) {
    int v;
    for (v = nv; v > 0; v--) start[v] = start[v - 1];
    start[0] = 0;
}

static void clothi_topology_incidence(const int *faces, cloth_topology *t) {
    int i;
    for (i = 0; i < 3 * t->nf; i++) t->vf_start[faces[i] + 1]++;
    clothi_csr_starts(t->nv, t->vf_start);
    for (i = 0; i < 3 * t->nf; i++) t->vf[t->vf_start[faces[i]]++] = i / 3;
    clothi_csr_rewind(t->nv, t->vf_start);
    /* edges come sorted, so each vertex meets its smaller neighbours first, each kind in order */
    for (i = 0; i < 2 * t->ne; i++) t->vv_start[t->edges[i] + 1]++;
    clothi_csr_starts(t->nv, t->vv_start);
    for (i = 0; i < 2 * t->ne; i++) t->vv[t->vv_start[t->edges[i]]++] = t->edges[i ^ 1];
    clothi_csr_rewind(t->nv, t->vv_start);
}

CLOTH_API cloth_status cloth_topology_create(const cloth_hooks *hooks, int nv, int nf,
                                             const int *faces, cloth_topology **out) {
    clothi_edge_sort sort;
    cloth_status     status;
    int              ne, nh;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_topology_create: out is NULL");
    *out = NULL;
    if (!faces && nf > 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_topology_create: faces is NULL");
    status = clothi_check_counts(hooks, nv, nf);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status != CLOTH_OK) return status;
    status = clothi_edge_sort_make(hooks, nv, nf, faces, &sort);
    if (status != CLOTH_OK) return status;
    status = clothi_count_edges(hooks, nf, faces, &sort, &ne, &nh);
    if (status != CLOTH_OK) goto done;
    *out = clothi_topology_alloc(hooks, nv, nf, ne, nh);
    if (!*out) {
        status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for a topology of %i edges", ne);
        goto done;
    }
    clothi_topology_edges(faces, &sort, *out);
    memset(sort.work, 0, 3 * (size_t)nf * sizeof(int));             /* ne <= 3 nf */
    clothi_topology_loops(faces, *out, sort.work);
    clothi_topology_incidence(faces, *out);
done:
    clothi_edge_sort_free(hooks, &sort);
    return status;
}

CLOTH_API void cloth_topology_destroy(const cloth_hooks *hooks, cloth_topology *topology) {
    clothi_free(hooks, topology);
}

/* ===== [4.3] GENERATORS ====================================================================== */

/* ===== [4.4] REST SHAPE ====================================================================== */

/* ===== [4.5] OBJ FILES ======================================================================= */

/* ===== [5.1] MATERIALS ======================================================================= */

/* ===== [6.1] SPRING ========================================================================== */

/* ===== [6.2] STVK TRIANGLE =================================================================== */

/* ===== [6.3] HINGE =========================================================================== */

/* ===== [6.4] QUADRATIC BENDING =============================================================== */

/* ===== [6.5] EIGHT ELEMENTS AT A TIME ======================================================== */

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
