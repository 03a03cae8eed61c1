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

/* Faults of one kind that cloth_mesh_check spells out before it only counts them. */
#define CLOTH_MESH_FAULTS_LOGGED 10

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

/* --- mesh: check --- */

/* Faults that cloth_mesh_check counts: name, value, 1 = cannot be simulated or 0 = warning,
 * what one is called. */
#define CLOTH_MESH_FAULT_LIST(X)                                                                 \
    X(CLOTH_MESH_INDEX,        0, 1, "index out of range")                                       \
    X(CLOTH_MESH_NONFINITE,    1, 1, "number NaN or infinite")                                   \
    X(CLOTH_MESH_REPEATED,     2, 1, "repeated corner")                                          \
    X(CLOTH_MESH_ZERO_AREA,    3, 1, "zero-area triangle")                                       \
    X(CLOTH_MESH_DUPLICATE,    4, 1, "duplicate face")                                           \
    X(CLOTH_MESH_THREE_FACES,  5, 1, "edge with three or more faces")                            \
    X(CLOTH_MESH_ORIENTATION,  6, 1, "edge with faces of opposite orientation")                  \
    X(CLOTH_MESH_PATTERN,      7, 1, "face with mirrored or zero-area pattern corners")          \
    X(CLOTH_MESH_ISOLATED,     8, 0, "isolated vertex")                                          \
    X(CLOTH_MESH_BOW_TIE,      9, 0, "vertex where separate fans touch")                         \
    X(CLOTH_MESH_SLIVER,      10, 0, "sliver")

typedef enum cloth_mesh_fault {
#define CLOTH_X(name, value, error, text) name = value,
    CLOTH_MESH_FAULT_LIST(CLOTH_X)
#undef CLOTH_X
    CLOTH_MESH_FAULT_COUNT = 11,
    CLOTH_MESH_FAULT_FORCE_INT = 0x7fffffff
} cloth_mesh_fault;

/* What index means: the face for INDEX, REPEATED, ZERO_AREA, DUPLICATE (the later of the two),
 * THREE_FACES and ORIENTATION (a face at that edge), PATTERN and SLIVER; the vertex for ISOLATED
 * and BOW_TIE; for NONFINITE the number: i of x[i], or 3 nv + i of X[i].                      */
typedef struct cloth_mesh_report {
    int errors, warnings;                   /* sums over the kinds                             */
    int count[CLOTH_MESH_FAULT_COUNT];      /* faults of each cloth_mesh_fault                 */
    int first[CLOTH_MESH_FAULT_COUNT];      /* index of the first one, -1: none                */
} cloth_mesh_report;

/* --- mesh: a mesh and its generators --- */

/* A triangle mesh in one block, owned by the caller: cloth_mesh_destroy. The arrays may be
 * written; the counts and pointers are to stay.                                               */
typedef struct cloth_mesh {
    int     nv, nf;
    double *x;              /* [nv x 3] m                                                      */
    int    *faces;          /* [nf x 3] counter-clockwise seen from where the normals point    */
    double *X;              /* [nf x 3 x 2] m pattern coordinates of the corners, or NULL      */
    int     npart;          /* parts; 0 when part is NULL                                      */
    int    *part;           /* [nf] in [0, npart), or NULL                                     */
    int     nr;             /* render corners: distinct pairs of vertex and texture point; 0:
                               none, and the three arrays below are NULL                       */
    int    *render_vertex;  /* [nr] vertex of each render corner, increasing                   */
    int    *render_faces;   /* [nf x 3] faces in render corners                                */
    double *vt;             /* [nr x 2] texture coordinates                                    */
} cloth_mesh;

typedef enum cloth_sheet_pattern {
    CLOTH_SHEET_EQUILATERAL = 0,    /* rows shifted by half an edge: least mesh bias           */
    CLOTH_SHEET_ALTERNATING = 1,    /* a grid, diagonals / and \ in turn                       */
    CLOTH_SHEET_DIAGONAL    = 2,    /* a grid, all diagonals one way: up to 3 times too stiff
                                       across them                                             */
    CLOTH_SHEET_FORCE_INT = 0x7fffffff
} cloth_sheet_pattern;

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

/* --- mesh: check --- */

/* Names every fault of a mesh with its index and what to do, through the logger.       [4.1]
 * in   x       [nv x 3] m
 * in   faces   [nf x 3]
 * in   X       [nf x 3 x 2] m pattern coordinates of the corners, or NULL
 * out  report  counts per kind, may be NULL; all zero when the call itself is refused
 * returns CLOTH_OK (warnings are counted); CLOTH_ERR_NONFINITE: a number is NaN or infinite;
 *   CLOTH_ERR_MESH: any other error, or no faces; CLOTH_ERR_ARGUMENT; CLOTH_ERR_MEMORY.
 * A face with a bad index or a repeated corner, and every copy of a face but the first, are
 * named once and left out of the edges, so that one mistake is not reported three times.
 * The first CLOTH_MESH_FAULTS_LOGGED of a kind are spelled out, the others counted.
 * contract: alloc scratch | cost O(nv + nf) | deterministic */
CLOTH_API cloth_status cloth_mesh_check(const cloth_hooks *hooks, int nv, const double *x, int nf,
                                        const int *faces, const double *X,
                                        cloth_mesh_report *report);

/* --- mesh: rest shape --- */

/* Lays every triangle flat: first vertex at the origin, the edge to the second along +x, the
 * third in the upper half plane.                                                       [4.4]
 * in   x      [nv x 3] m
 * in   faces  [nf x 3]
 * out  X      [nf x 3 x 2] m; written only when every triangle can be: unchanged on failure
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: NULL or a count out of range; CLOTH_ERR_NONFINITE: x;
 *   CLOTH_ERR_MESH: index out of range or zero-area triangle (height at most 1e-12 of the longest
 *   edge, or within the rounding of the coordinates). cloth_mesh_check finds the index.
 * Edge lengths agree with x to 1e-15 relative, in a needle to 1.2e-16 long edge / short edge.
 * contract: alloc none | cost O(nv + nf), 3 square roots a triangle | threads: distinct X */
CLOTH_API cloth_status cloth_flatten(int nv, const double *x, int nf, const int *faces, double *X);

/* --- mesh: generators --- */

/* Every generator and reader: *out is owned (cloth_mesh_destroy with the same hooks) and NULL on
 * failure; CLOTH_ERR_ARGUMENT names the argument; CLOTH_ERR_MEMORY; alloc one block; O(size).
 * Generated meshes pass cloth_mesh_check without a warning as long as the sizes given make no
 * slivers, and carry X, an exact unrolling: the edges in X are as long as those in x.  [4.3] */

/* A flat sheet, width (along x) by height (along z), y = 0, normals +y; X = (x, -z).
 * in   nx, ny  vertices along x and along z, at least 2 each
 *   ALTERNATING, DIAGONAL: vertex j nx + i at (i width/(nx-1), 0, j height/(ny-1)); 2 (nx-1)(ny-1)
 *     faces. Cell (i, j) has its diagonal from (i, j) to (i+1, j+1); ALTERNATING turns it where
 *     i + j is odd.
 *   EQUILATERAL: edge a = width/(nx-1). Even rows have nx vertices at i a; odd rows nx + 1, at 0,
 *     a/2, 3a/2, .., width: half triangles at their ends keep the sides straight. Row j starts at
 *     vertex j nx + j/2; (ny-1)(2 nx - 1) faces. The triangles are equilateral when height =
 *     (ny-1) a sqrt(3)/2, else isosceles; ny = 0 takes the number of rows nearest to it.
 * in   width, height  m, finite and > 0 */
CLOTH_API cloth_status cloth_mesh_sheet(const cloth_hooks *hooks, cloth_sheet_pattern pattern,
                                        int nx, int ny, double width, double height,
                                        cloth_mesh **out);

/* An open tube around the y axis, y = 0 .. height, normals outward, of congruent isosceles
 * triangles: odd rows are turned by half a step. Vertex j around + i of row j at the angle
 * 2 pi (i + (j odd)/2)/around from +x towards -z; 2 around (along-1) faces. X: unrolled, the seam
 * at i = 0, each corner on its face's side of it.
 * in   around >= 3, along >= 2  vertices;  radius, height  m */
CLOTH_API cloth_status cloth_mesh_tube(const cloth_hooks *hooks, double radius, double height,
                                       int around, int along, cloth_mesh **out);

/* A flat disc, y = 0, normals +y: vertex 0 in the middle, ring k = 1 .. rings of 6 k vertices at
 * radius k/rings from vertex 1 + 3 k (k-1), from +x towards -z; 6 rings^2 faces, no angle under 40
 * degrees. X = (x, -z).
 * in   radius m;  rings >= 1 */
CLOTH_API cloth_status cloth_mesh_disc(const cloth_hooks *hooks, double radius, int rings,
                                       cloth_mesh **out);

/* Several cloths as one mesh: vertices, faces and render corners one behind the other. part: the
 * parts of each mesh follow those of the one before; a mesh without parts counts as one. X: when
 * any mesh has it; the others are laid flat (cloth_flatten). Render corners likewise: a mesh
 * without them gets its vertices, at (0, 0).
 * in   meshes  [count] borrowed during the call
 * returns also CLOTH_ERR_MESH, CLOTH_ERR_NONFINITE: from cloth_flatten; CLOTH_ERR_CAPACITY */
CLOTH_API cloth_status cloth_mesh_merge(const cloth_hooks *hooks, cloth_mesh *const *meshes,
                                        int count, cloth_mesh **out);

CLOTH_API void cloth_mesh_destroy(const cloth_hooks *hooks, cloth_mesh *mesh);

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

/* ===== [4.1] MESH CHECK ========================================================================
 *
 * A mesh from outside is read by a person who must mend it: every fault is named with its index
 * and a remedy, all in one call. Three passes: numbers and corners face by face; copies of a
 * face by sorting faces; edges by sorting half-edges (the sort serves [4.2] too).
 *
 *      x2                       The shape of a triangle, seen from its edge e = x1 - x0:
 *      /|\                         l = |e|,  p = e.(x2 - x0)/l,  q = |e x (x2 - x0)|/l
 *     / |q\                     and X0 = (0,0), X1 = (l,0), X2 = (p,q) lays it flat [4.4].
 *    /  |  \                    In a needle whose short side is x1-x2 the difference p - l
 *  x0-p-+---x1                  would keep few digits; then p = l + e.(x2 - x1)/l and
 *                               q = |e x (x2 - x1)|/l, from the short side itself, lose none
 *                               beside the rounding of p.
 *
 * Zero area: height = l q / longest edge is at most CLOTHI_EPS_AREA of the longest edge, or
 * within CLOTHI_EPS_COORD of the coordinates, where it is made of their rounding.
 * Bow-ties: the corners at a vertex form one fan when the edges join them all. Union-find over
 * the 3 nf corners: fans at v = corners at v - joins at v that were news.
 * checked: tests/test_mesh.c, tests/test_rest.c */

#define CLOTHI_EPS_AREA  1e-12              /* height over longest edge: zero area             */
#define CLOTHI_EPS_COORD 8.9e-16            /* height over largest coordinate: 4 roundings     */
#define CLOTHI_SLIVER    1e-4               /* height over longest edge: a warning             */

typedef struct clothi_triangle {
    double l, p, q;     /* m; all zero when the triangle is degenerate                         */
    double shape;       /* height / longest edge; 0 when degenerate                            */
} clothi_triangle;

/* Largest magnitude of a [n]. */
static double clothi_max_abs(const double *a, int n) {
    double max = 0;
    int    i;
    for (i = 0; i < n; i++) max = fabs(a[i]) > max ? fabs(a[i]) : max;
    return max;
}

/* Corners a, b, c, finite. Works on numbers scaled by a power of two, so that no square over- or
 * underflows. Returns 0 when degenerate (or when its size overflows), else 1. */
static int clothi_triangle_shape(const double *a, const double *b, const double *c,
                                 clothi_triangle *t) {
    double e[9], n[3], size, back, l, d2, d12, longest, coord, height;
    double *d = e + 3, *g = e + 6;
    int    k, exponent;
    memset(t, 0, sizeof *t);
    for (k = 0; k < 3; k++) {               /* quarters: the difference cannot overflow        */
        e[k] = 0.25 * b[k] - 0.25 * a[k];
        d[k] = 0.25 * c[k] - 0.25 * a[k];
        g[k] = 0.25 * c[k] - 0.25 * b[k];
    }
    size = clothi_max_abs(e, 9);
    if (!(size > 0)) return 0;
    (void)frexp(size, &exponent);
    if (exponent < -1000) exponent = -1000;
    for (k = 0; k < 9; k++) e[k] = ldexp(e[k], -exponent);
    coord = fmax(fmax(clothi_max_abs(a, 3), clothi_max_abs(b, 3)), clothi_max_abs(c, 3));
    coord = ldexp(0.25 * coord, -exponent);
    l = sqrt(clothi_dot3(e, e));
    d2 = clothi_dot3(d, d);
    d12 = clothi_dot3(g, g);
    longest = fmax(l, sqrt(fmax(d2, d12)));
    if (!(l > 0)) return 0;
    clothi_cross3(e, d12 < d2 ? g : d, n);
    t->q = sqrt(clothi_dot3(n, n)) / l;
    t->p = d12 < d2 ? l + clothi_dot3(e, g) / l : clothi_dot3(e, d) / l;
    height = l * t->q / longest;
    if (!(height > CLOTHI_EPS_AREA * longest && height > CLOTHI_EPS_COORD * coord)) {
        memset(t, 0, sizeof *t);
        return 0;
    }
    back = ldexp(1.0, exponent) * 4.0;
    t->shape = height / longest;
    t->l = l * back;
    t->p *= back;
    t->q *= back;
    if (clothi_finite(t->l) && clothi_finite(t->p) && clothi_finite(t->q)) return 1;
    memset(t, 0, sizeof *t);
    return 0;
}

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

typedef struct clothi_checker {
    const cloth_hooks *hooks;
    cloth_mesh_report  report;
    int     nv, nf;
    const double *x, *X;
    const int    *faces;
    int    *kept;       /* [nf x 3] the faces whose edges can be looked at                     */
    int    *id;         /* [nf] their numbers in faces                                         */
    int     nk;
    int    *corners;    /* [nv] corners at a vertex, of any face                               */
} clothi_checker;

static int clothi_fault_is_error(cloth_mesh_fault kind) {
    switch (kind) {
#define CLOTH_X(name, value, error, text) case name: return error;
    CLOTH_MESH_FAULT_LIST(CLOTH_X)
#undef CLOTH_X
    case CLOTH_MESH_FAULT_COUNT: case CLOTH_MESH_FAULT_FORCE_INT: break;
    }
    return 1;
}

static const char *clothi_fault_text(cloth_mesh_fault kind) {
    switch (kind) {
#define CLOTH_X(name, value, error, text) case name: return text;
    CLOTH_MESH_FAULT_LIST(CLOTH_X)
#undef CLOTH_X
    case CLOTH_MESH_FAULT_COUNT: case CLOTH_MESH_FAULT_FORCE_INT: break;
    }
    return "fault";
}

static cloth_status clothi_fault_status(cloth_mesh_fault kind) {
    if (!clothi_fault_is_error(kind)) return CLOTH_OK;
    return kind == CLOTH_MESH_NONFINITE ? CLOTH_ERR_NONFINITE : CLOTH_ERR_MESH;
}

/* Counts a fault; true when it is to be spelled out. */
static int clothi_fault_count(clothi_checker *c, cloth_mesh_fault kind, int index) {
    if (c->report.count[kind] == 0) c->report.first[kind] = index;
    if (clothi_fault_is_error(kind)) c->report.errors++;
    else c->report.warnings++;
    return c->report.count[kind]++ < CLOTH_MESH_FAULTS_LOGGED;
}

#define CLOTHI_FAULT(c, kind, index, ...)                                                        \
    do {                                                                                         \
        if (clothi_fault_count(c, kind, index))                                                  \
            clothi_say((c)->hooks,                                                               \
                       clothi_fault_is_error(kind) ? CLOTH_LOG_ERROR : CLOTH_LOG_WARNING,        \
                       clothi_fault_status(kind), __VA_ARGS__);                                  \
    } while (0)

static void clothi_check_numbers(clothi_checker *c) {
    static const char *const axis[] = {"x", "y", "z"};
    int i;
    for (i = 0; i < 3 * c->nv; i++)
        if (!clothi_finite(c->x[i]))
            CLOTHI_FAULT(c, CLOTH_MESH_NONFINITE, i, "vertex %i: %s is %g: give it a number",
                         i / 3, axis[i % 3], c->x[i]);
    for (i = 0; c->X && i < 6 * c->nf; i++)
        if (!clothi_finite(c->X[i]))
            CLOTHI_FAULT(c, CLOTH_MESH_NONFINITE, 3 * c->nv + i,
                         "pattern: corner %i of face %i: %s is %g: give it a number", i / 2 % 3,
                         i / 6, axis[i % 2], c->X[i]);
}

/* Pattern corners P [3 x 2], finite, of face f: a counter-clockwise triangle. */
static void clothi_check_pattern(clothi_checker *c, int f, const double *P) {
    double          P3[9];
    clothi_triangle t;
    int             k;
    for (k = 0; k < 3; k++) {
        P3[3 * k] = P[2 * k];
        P3[3 * k + 1] = P[2 * k + 1];
        P3[3 * k + 2] = 0;
    }
    if (!clothi_triangle_shape(P3, P3 + 3, P3 + 6, &t))
        CLOTHI_FAULT(c, CLOTH_MESH_PATTERN, f, "pattern: face %i has no area: move its corners "
                     "apart or leave the pattern out", f);
    else if ((0.5 * P[2] - 0.5 * P[0]) * (0.5 * P[5] / t.q - 0.5 * P[1] / t.q) <
             (0.5 * P[4] - 0.5 * P[0]) * (0.5 * P[3] / t.q - 0.5 * P[1] / t.q))
        CLOTHI_FAULT(c, CLOTH_MESH_PATTERN, f, "pattern: face %i is mirrored (negative area): "
                     "mirror its panel or reverse its corners", f);
}

/* One face: indices, corners, area, pattern. True when its edges can be looked at. */
static int clothi_check_face(clothi_checker *c, int f) {
    const int *t = c->faces + 3 * f;
    int        k, bad = 0, finite = 1;
    for (k = 0; k < 3; k++) {
        if (t[k] < 0 || t[k] >= c->nv) {
            bad = 1;
            CLOTHI_FAULT(c, CLOTH_MESH_INDEX, f, "face %i: corner %i = %i but nv = %i: use 0 .. "
                         "nv-1 or remove the face", f, k, t[k], c->nv);
        } else {
            c->corners[t[k]]++;
            finite = finite && clothi_find_nonfinite(c->x + 3 * t[k], 3) < 0;
        }
    }
    if (c->X && clothi_find_nonfinite(c->X + 6 * (size_t)f, 6) < 0)
        clothi_check_pattern(c, f, c->X + 6 * (size_t)f);
    if (bad) return 0;
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
        CLOTHI_FAULT(c, CLOTH_MESH_REPEATED, f, "face %i: corners %i %i %i repeat a vertex: "
                     "remove the face", f, t[0], t[1], t[2]);
        return 0;
    }
    if (finite) {
        clothi_triangle s;
        if (!clothi_triangle_shape(c->x + 3 * t[0], c->x + 3 * t[1], c->x + 3 * t[2], &s))
            CLOTHI_FAULT(c, CLOTH_MESH_ZERO_AREA, f, "face %i: corners %i %i %i span no area: "
                         "move one or merge vertices and remove the face", f, t[0], t[1], t[2]);
        else if (s.shape < CLOTHI_SLIVER)
            CLOTHI_FAULT(c, CLOTH_MESH_SLIVER, f, "face %i: a sliver, %g times longer than high:"
                         " it will be stiff; remesh there", f, 1 / s.shape);
    }
    return 1;
}

/* Removes from kept every face whose three vertices an earlier face has. */
static cloth_status clothi_check_duplicates(clothi_checker *c) {
    const size_t n = (size_t)c->nk;
    int *key = (int *)clothi_alloc(c->hooks, 6 * n + (size_t)c->nv + 1u, sizeof(int));
    int *order, *work, *drop, *count, i, j, k;
    if (!key) return clothi_fail(c->hooks, CLOTH_ERR_MEMORY, "no memory to check %i faces", c->nf);
    order = key + 3 * n;
    work = order + n;
    drop = work + n;
    count = drop + n;
    for (i = 0; i < c->nk; i++) {           /* key: lowest [nk], middle [nk], highest [nk]     */
        const int *t = c->kept + 3 * i;
        const int  lo = t[0] < t[1] ? (t[0] < t[2] ? t[0] : t[2]) : (t[1] < t[2] ? t[1] : t[2]);
        const int  hi = t[0] > t[1] ? (t[0] > t[2] ? t[0] : t[2]) : (t[1] > t[2] ? t[1] : t[2]);
        key[i] = lo;
        key[n + (size_t)i] = (int)((long long)t[0] + t[1] + t[2] - lo - hi);
        key[2 * n + (size_t)i] = hi;
    }
    clothi_sort_by(c->nk, c->nv, key + 2 * n, NULL, order, count);
    clothi_sort_by(c->nk, c->nv, key + n, order, work, count);
    clothi_sort_by(c->nk, c->nv, key, work, order, count);
    for (i = 1, j = 0; i < c->nk; i++) {    /* j: first of the run of equal faces              */
        const size_t a = (size_t)order[j], b = (size_t)order[i];
        if (key[a] != key[b] || key[n + a] != key[n + b] || key[2 * n + a] != key[2 * n + b])
            j = i;
        else
            drop[b] = 1 + order[j];
    }
    for (i = 0, j = 0; i < c->nk; i++) {
        if (drop[i]) {
            CLOTHI_FAULT(c, CLOTH_MESH_DUPLICATE, c->id[i], "face %i has the corners of face %i:"
                         " remove one of them", c->id[i], work[drop[i] - 1]);
            continue;
        }
        work[i] = c->id[i];                 /* id[] moves down; copies come after their first  */
        for (k = 0; k < 3; k++) c->kept[3 * j + k] = c->kept[3 * i + k];
        c->id[j++] = c->id[i];
    }
    c->nk = j;
    clothi_free(c->hooks, key);
    return CLOTH_OK;
}

static int clothi_find_root(int *parent, int i) {
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/* Joins two corners of one vertex; 1 when they were apart. The smaller number is the root. */
static int clothi_join(int *parent, int i, int j) {
    i = clothi_find_root(parent, i);
    j = clothi_find_root(parent, j);
    if (i == j) return 0;
    if (i < j) parent[j] = i;
    else parent[i] = j;
    return 1;
}

/* The half-edge g of face g/3 at vertex v: the corner of that face that is v; v is an end. */
static int clothi_corner_at(const int *faces, int g, int v) {
    return faces[g] == v ? g : clothi_halfedge_next(g);
}

/* Faults of edges; fans [nv] loses one for every pair of corners that an edge joins. */
static void clothi_check_edges(clothi_checker *c, const clothi_edge_sort *s, int *fans) {
    int *parent = s->work;
    int  i, j, end, n = 3 * c->nk;
    for (i = 0; i < n; i++) parent[i] = i;
    for (i = 0; i < n; i = end) {
        const int g = s->order[i], a = s->lo[g], b = s->hi[g];
        end = clothi_edge_run(s, n, i);
        for (j = i + 1; j < end; j++) {
            const int h = s->order[j];
            fans[a] -= clothi_join(parent, clothi_corner_at(c->kept, g, a),
                                   clothi_corner_at(c->kept, h, a));
            fans[b] -= clothi_join(parent, clothi_corner_at(c->kept, g, b),
                                   clothi_corner_at(c->kept, h, b));
        }
        if (end - i > 2)
            CLOTHI_FAULT(c, CLOTH_MESH_THREE_FACES, c->id[g / 3], "edge %i-%i has %i faces, among "
                         "them %i, %i and %i: cut all but two off by doubling its vertices", a, b,
                         end - i, c->id[g / 3], c->id[s->order[i + 1] / 3],
                         c->id[s->order[i + 2] / 3]);
        else if (end - i == 2 && c->kept[g] == c->kept[s->order[i + 1]])
            CLOTHI_FAULT(c, CLOTH_MESH_ORIENTATION, c->id[g / 3], "faces %i and %i both run "
                         "%i -> %i: reverse the corners of one (a one-sided surface must be cut)",
                         c->id[g / 3], c->id[s->order[i + 1] / 3], c->kept[g],
                         c->kept[clothi_halfedge_next(g)]);
    }
}

static cloth_status clothi_check_surface(clothi_checker *c) {
    clothi_edge_sort sort;
    cloth_status     status;
    int             *fans = NULL, i, v;
    status = clothi_check_duplicates(c);
    if (status != CLOTH_OK) return status;
    status = clothi_edge_sort_make(c->hooks, c->nv, c->nk, c->kept, &sort);
    if (status != CLOTH_OK) return status;
    fans = (int *)clothi_alloc(c->hooks, (size_t)c->nv, sizeof(int));
    if (!fans) {
        status = clothi_fail(c->hooks, CLOTH_ERR_MEMORY, "no memory to check %i vertices", c->nv);
        goto done;
    }
    for (i = 0; i < 3 * c->nk; i++) fans[c->kept[i]]++;
    clothi_check_edges(c, &sort, fans);
    for (v = 0; v < c->nv; v++) {
        if (c->corners[v] == 0)
            CLOTHI_FAULT(c, CLOTH_MESH_ISOLATED, v, "vertex %i has no face: it moves as a point"
                         " without mass; remove it", v);
        else if (fans[v] > 1)
            CLOTHI_FAULT(c, CLOTH_MESH_BOW_TIE, v, "vertex %i joins %i surfaces in a point: "
                         "double it, or accept a ball joint", v, fans[v]);
    }
done:
    clothi_free(c->hooks, fans);
    clothi_edge_sort_free(c->hooks, &sort);
    return status;
}

static void clothi_check_summary(const clothi_checker *c) {
    int kind;
    for (kind = 0; kind < CLOTH_MESH_FAULT_COUNT; kind++) {
        const cloth_mesh_fault fault = (cloth_mesh_fault)kind;
        if (c->report.count[kind] > CLOTH_MESH_FAULTS_LOGGED)
            clothi_say(c->hooks,
                       clothi_fault_is_error(fault) ? CLOTH_LOG_ERROR : CLOTH_LOG_WARNING,
                       clothi_fault_status(fault), "%s: %i in all, %i not listed",
                       clothi_fault_text(fault), c->report.count[kind],
                       c->report.count[kind] - CLOTH_MESH_FAULTS_LOGGED);
    }
}

CLOTH_API cloth_status cloth_mesh_check(const cloth_hooks *hooks, int nv, const double *x, int nf,
                                        const int *faces, const double *X,
                                        cloth_mesh_report *report) {
    clothi_checker c;
    cloth_status   status;
    int            f, k;
    memset(&c, 0, sizeof c);
    if (report) *report = c.report;
    status = clothi_check_counts(hooks, nv, nf);
    if (status != CLOTH_OK) return status;
    if (nv == 0 || nf == 0)
        return clothi_fail(hooks, CLOTH_ERR_MESH, "the mesh has %i vertices and %i faces", nv, nf);
    if (!x || !faces)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_mesh_check: %s is NULL",
                           x ? "faces" : "x");
    c.hooks = hooks;
    c.nv = nv;
    c.nf = nf;
    c.x = x;
    c.X = X;
    c.faces = faces;
    for (k = 0; k < CLOTH_MESH_FAULT_COUNT; k++) c.report.first[k] = -1;
    c.kept = (int *)clothi_alloc(hooks, 4 * (size_t)nf + (size_t)nv, sizeof(int));
    if (!c.kept)
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to check %i faces", nf);
    c.id = c.kept + 3 * (size_t)nf;
    c.corners = c.id + nf;
    clothi_check_numbers(&c);
    for (f = 0; f < nf; f++) {
        if (!clothi_check_face(&c, f)) continue;
        for (k = 0; k < 3; k++) c.kept[3 * c.nk + k] = faces[3 * f + k];
        c.id[c.nk++] = f;
    }
    status = clothi_check_surface(&c);
    clothi_free(hooks, c.kept);
    if (status != CLOTH_OK) return status;
    clothi_check_summary(&c);
    if (report) *report = c.report;
    if (c.report.errors == 0) return CLOTH_OK;
    return c.report.count[CLOTH_MESH_NONFINITE] ? CLOTH_ERR_NONFINITE : CLOTH_ERR_MESH;
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

/* ===== [4.3] GENERATORS ========================================================================
 *
 *   EQUILATERAL           ALTERNATING      DIAGONAL       disc, one of six sectors
 *   +--+-----+-----+--+   +---+---+---+    +---+---+---+          +---+---+---+
 *   |\/ \   / \   / \/|   |\  |  /|\  |    |\  |\  |\  |           \ / \ / \ /
 *   | \  \ /   \ /  / |   | \ | / | \ |    | \ | \ | \ |            +---+---+
 *   +--+--+-----+--+--+   |  \|/  |  \|    |  \|  \|  \|             \ / \ /
 *    (rows of nx and      +---+---+---+    +---+---+---+              +---+
 *     nx + 1 vertices)                                                 \ / middle
 *
 * A sheet lies in x and z, and y is up. Seen from above (from where its normals point) x is to
 * the right and z comes towards the reader, so a counter-clockwise face is one in (x, -z): that is
 * the pattern X.
 * The tube's triangles, two kinds of one shape (base on the row below or above), unroll without
 * stretch: base c = 2 r sin(pi/around), height H with H^2 = dy^2 + r^2 (1 - cos(pi/around))^2.
 * checked: tests/test_mesh.c */

static size_t clothi_round8(size_t bytes) { return (bytes + 7u) / 8u * 8u; }

/* All arrays of a mesh in one block; nr < 0: no render corners. */
static cloth_mesh *clothi_mesh_alloc(const cloth_hooks *hooks, int nv, int nf, int with_X,
                                     int npart, int nr) {
    const size_t v = (size_t)nv, f = (size_t)nf, r = nr > 0 ? (size_t)nr : 0;
    const size_t head = clothi_round8(sizeof(cloth_mesh));
    const size_t doubles = 3 * v + (with_X ? 6 * f : 0) + 2 * r;
    const size_t ints = 3 * f + (npart > 0 ? f : 0) + r + (r ? 3 * f : 0);
    cloth_mesh  *m = (cloth_mesh *)clothi_alloc(hooks, head + 8u * doubles + sizeof(int) * ints,
                                                1);
    double *d;
    int    *i;
    if (!m) {
        clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for a mesh of %i vertices and %i faces",
                    nv, nf);
        return NULL;
    }
    d = (double *)(void *)((char *)m + head);
    i = (int *)(void *)(d + doubles);
    m->nv = nv;
    m->nf = nf;
    m->npart = npart > 0 ? npart : 0;
    m->nr = (int)r;
    m->x = d;
    d += 3 * v;
    if (with_X) m->X = d;
    d += with_X ? 6 * f : 0;
    if (r) m->vt = d;
    m->faces = i;
    i += 3 * f;
    if (npart > 0) m->part = i;
    i += npart > 0 ? f : 0;
    if (r) m->render_vertex = i;
    i += r;
    if (r) m->render_faces = i;
    return m;
}

CLOTH_API void cloth_mesh_destroy(const cloth_hooks *hooks, cloth_mesh *mesh) {
    clothi_free(hooks, mesh);
}

static cloth_status clothi_check_size(const cloth_hooks *hooks, const char *name, double a) {
    if (clothi_finite(a) && a > 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s = %g must be finite and > 0", name, a);
}

static cloth_status clothi_check_least(const cloth_hooks *hooks, const char *name, int n,
                                       int least) {
    if (n >= least) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s = %i must be at least %i", name, n, least);
}

/* nv and nf as computed in double, so that no product overflows on the way. */
static cloth_status clothi_check_total(const cloth_hooks *hooks, double nv, double nf) {
    if (nv <= CLOTH_MAX_COUNT && nf <= CLOTH_MAX_COUNT) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%g vertices and %g faces: at most %i of each",
                       nv, nf, CLOTH_MAX_COUNT);
}

/* Appends face a b c at *f. */
static void clothi_add_face(cloth_mesh *m, int *f, int a, int b, int c) {
    int *t = m->faces + 3 * (*f)++;
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

/* X of a sheet or disc in the x-z plane. */
static void clothi_flat_pattern(cloth_mesh *m) {
    int i;
    for (i = 0; i < 3 * m->nf; i++) {
        m->X[2 * (size_t)i] = m->x[3 * m->faces[i]];
        m->X[2 * (size_t)i + 1] = -m->x[3 * m->faces[i] + 2];
    }
}

static void clothi_sheet_grid(cloth_mesh *m, int nx, int ny, double width, double height,
                              int alternating) {
    int i, j, f = 0;
    for (j = 0; j < ny; j++)
        for (i = 0; i < nx; i++) {
            m->x[3 * (j * nx + i)] = width * i / (nx - 1);
            m->x[3 * (j * nx + i) + 2] = height * j / (ny - 1);
        }
    for (j = 0; j < ny - 1; j++)
        for (i = 0; i < nx - 1; i++) {
            const int a = j * nx + i, b = a + 1, c = a + nx, d = c + 1;
            if (alternating && (i + j) % 2 == 1) {
                clothi_add_face(m, &f, a, c, b);
                clothi_add_face(m, &f, b, c, d);
            } else {
                clothi_add_face(m, &f, a, d, b);
                clothi_add_face(m, &f, a, c, d);
            }
        }
}

static void clothi_sheet_shifted(cloth_mesh *m, int nx, int ny, double width, double height) {
    int i, j, f = 0;
    for (j = 0; j < ny; j++) {
        const int row = j * nx + j / 2, odd = j % 2;
        for (i = 0; i < nx + odd; i++) {
            double *p = m->x + 3 * (row + i);
            p[0] = odd ? width * (i == 0 ? 0.0 : i == nx ? 1.0 : (i - 0.5) / (nx - 1))
                       : width * i / (nx - 1);
            p[2] = height * j / (ny - 1);
        }
    }
    for (j = 0; j < ny - 1; j++) {
        const int row = j * nx + j / 2, next = (j + 1) * nx + (j + 1) / 2, odd = j % 2;
        const int even_row = odd ? next : row, odd_row = odd ? row : next;
        for (i = 0; i < nx; i++) {          /* base on the odd row, tip on the even one        */
            const int a = odd_row + i, tip = even_row + i;
            if (odd) clothi_add_face(m, &f, a, tip, a + 1);
            else clothi_add_face(m, &f, a, a + 1, tip);
            if (i == nx - 1) continue;      /* base on the even row, tip on the odd one        */
            if (odd) clothi_add_face(m, &f, tip, tip + 1, a + 1);
            else clothi_add_face(m, &f, tip, a + 1, tip + 1);
        }
    }
}

CLOTH_API cloth_status cloth_mesh_sheet(const cloth_hooks *hooks, cloth_sheet_pattern pattern,
                                        int nx, int ny, double width, double height,
                                        cloth_mesh **out) {
    const int    shifted = pattern == CLOTH_SHEET_EQUILATERAL;
    cloth_status status;
    double       nv, nf;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_mesh_sheet: out is NULL");
    *out = NULL;
    if (!shifted && pattern != CLOTH_SHEET_ALTERNATING && pattern != CLOTH_SHEET_DIAGONAL)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "pattern = %i is none of CLOTH_SHEET_",
                           (int)pattern);
    status = clothi_check_size(hooks, "width", width);
    if (status == CLOTH_OK) status = clothi_check_size(hooks, "height", height);
    if (status == CLOTH_OK) status = clothi_check_least(hooks, "nx", nx, 2);
    if (status == CLOTH_OK && shifted && ny == 0) {
        const double rows = height / width * (nx - 1) / sqrt(0.75);
        ny = rows < 1.5 ? 2 : rows < CLOTH_MAX_COUNT ? (int)(rows + 0.5) + 1 : CLOTH_MAX_COUNT;
    }
    if (status == CLOTH_OK) status = clothi_check_least(hooks, "ny", ny, 2);
    if (status != CLOTH_OK) return status;
    nv = (double)nx * ny + (shifted ? ny / 2 : 0);
    nf = (ny - 1.0) * (shifted ? 2.0 * nx - 1 : 2.0 * (nx - 1));
    status = clothi_check_total(hooks, nv, nf);
    if (status != CLOTH_OK) return status;
    *out = clothi_mesh_alloc(hooks, (int)nv, (int)nf, 1, 0, -1);
    if (!*out) return CLOTH_ERR_MEMORY;
    if (shifted) clothi_sheet_shifted(*out, nx, ny, width, height);
    else clothi_sheet_grid(*out, nx, ny, width, height, pattern == CLOTH_SHEET_ALTERNATING);
    clothi_flat_pattern(*out);
    return CLOTH_OK;
}

#define CLOTHI_PI 3.14159265358979323846

/* Pattern corner k of face f of a tube: half is twice the steps around, row counts up. */
static void clothi_tube_corner(cloth_mesh *m, int f, int k, int around, int half, int row,
                               double base, double rise) {
    double *P = m->X + 6 * (size_t)f + 2 * k;
    m->faces[3 * f + k] = row * around + (half - row % 2) / 2 % around;
    P[0] = 0.5 * base * half;
    P[1] = rise * row;
}

CLOTH_API cloth_status cloth_mesh_tube(const cloth_hooks *hooks, double radius, double height,
                                       int around, int along, cloth_mesh **out) {
    cloth_status status;
    double       base, rise, bulge;
    int          i, j, f = 0;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_mesh_tube: out is NULL");
    *out = NULL;
    status = clothi_check_size(hooks, "radius", radius);
    if (status == CLOTH_OK) status = clothi_check_size(hooks, "height", height);
    if (status == CLOTH_OK) status = clothi_check_least(hooks, "around", around, 3);
    if (status == CLOTH_OK) status = clothi_check_least(hooks, "along", along, 2);
    if (status == CLOTH_OK)
        status = clothi_check_total(hooks, (double)around * along, 2.0 * around * (along - 1.0));
    if (status != CLOTH_OK) return status;
    *out = clothi_mesh_alloc(hooks, around * along, 2 * around * (along - 1), 1, 0, -1);
    if (!*out) return CLOTH_ERR_MEMORY;
    for (j = 0; j < along; j++)
        for (i = 0; i < around; i++) {
            const double angle = CLOTHI_PI * (2.0 * i + j % 2) / around;
            double      *p = (*out)->x + 3 * (j * around + i);
            p[0] = radius * cos(angle);
            p[1] = height * j / (along - 1);
            p[2] = -radius * sin(angle);
        }
    base = 2 * radius * sin(CLOTHI_PI / around);
    bulge = 2 * radius * sin(0.5 * CLOTHI_PI / around) * sin(0.5 * CLOTHI_PI / around);
    rise = hypot(height / (along - 1), bulge);
    for (j = 0; j < along - 1; j++)
        for (i = 0; i < around; i++, f += 2) {
            const int h = 2 * i + j % 2;    /* half steps to this vertex of row j              */
            clothi_tube_corner(*out, f, 0, around, h, j, base, rise);
            clothi_tube_corner(*out, f, 1, around, h + 2, j, base, rise);
            clothi_tube_corner(*out, f, 2, around, h + 1, j + 1, base, rise);
            clothi_tube_corner(*out, f + 1, 0, around, h + 2, j, base, rise);
            clothi_tube_corner(*out, f + 1, 1, around, h + 3, j + 1, base, rise);
            clothi_tube_corner(*out, f + 1, 2, around, h + 1, j + 1, base, rise);
        }
    return CLOTH_OK;
}

/* Vertex i of ring k of a disc, i taken around. */
static int clothi_ring_vertex(int k, int i) {
    return k == 0 ? 0 : 1 + 3 * k * (k - 1) + i % (6 * k);
}

CLOTH_API cloth_status cloth_mesh_disc(const cloth_hooks *hooks, double radius, int rings,
                                       cloth_mesh **out) {
    cloth_status status;
    int          i, k, s, f = 0;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_mesh_disc: out is NULL");
    *out = NULL;
    status = clothi_check_size(hooks, "radius", radius);
    if (status == CLOTH_OK) status = clothi_check_least(hooks, "rings", rings, 1);
    if (status == CLOTH_OK)
        status = clothi_check_total(hooks, 1 + 3.0 * rings * (rings + 1.0), 6.0 * rings * rings);
    if (status != CLOTH_OK) return status;
    *out = clothi_mesh_alloc(hooks, 1 + 3 * rings * (rings + 1), 6 * rings * rings, 1, 0, -1);
    if (!*out) return CLOTH_ERR_MEMORY;
    for (k = 1; k <= rings; k++)
        for (i = 0; i < 6 * k; i++) {
            const double r = radius * k / rings, angle = CLOTHI_PI * i / (3.0 * k);
            double      *p = (*out)->x + 3 * clothi_ring_vertex(k, i);
            p[0] = r * cos(angle);
            p[2] = -r * sin(angle);
        }
    for (k = 1; k <= rings; k++)
        for (s = 0; s < 6; s++)
            for (i = 0; i < k; i++) {
                const int in = clothi_ring_vertex(k - 1, s * (k - 1) + i);
                const int end = clothi_ring_vertex(k, s * k + i + 1);
                clothi_add_face(*out, &f, clothi_ring_vertex(k, s * k + i), end, in);
                if (i == k - 1) continue;
                clothi_add_face(*out, &f, in, end, clothi_ring_vertex(k - 1, s * (k - 1) + i + 1));
            }
    clothi_flat_pattern(*out);
    return CLOTH_OK;
}

/* What the mesh `a` adds to `m` behind the vertices, faces, parts and render corners that the
 * counts in `at` say are there. */
static cloth_status clothi_mesh_append(const cloth_hooks *hooks, cloth_mesh *m,
                                       const cloth_mesh *a, const cloth_mesh *at) {
    const int *rf = a->nr > 0 ? a->render_faces : a->faces;
    const int  nr = a->nr > 0 ? a->nr : a->nv;
    int        i;
    memcpy(m->x + 3 * at->nv, a->x, 3 * sizeof(double) * (size_t)a->nv);
    for (i = 0; i < 3 * a->nf; i++) m->faces[3 * at->nf + i] = at->nv + a->faces[i];
    for (i = 0; i < a->nf; i++) m->part[at->nf + i] = at->npart + (a->part ? a->part[i] : 0);
    if (m->X && a->X)
        memcpy(m->X + 6 * (size_t)at->nf, a->X, 6 * sizeof(double) * (size_t)a->nf);
    else if (m->X) {
        cloth_status status = cloth_flatten(a->nv, a->x, a->nf, a->faces,
                                            m->X + 6 * (size_t)at->nf);
        if (status != CLOTH_OK)
            return clothi_fail(hooks, status, "cloth_mesh_merge: a mesh without pattern cannot be "
                               "laid flat: cloth_mesh_check says where");
    }
    if (m->nr == 0) return CLOTH_OK;
    for (i = 0; i < 3 * a->nf; i++) m->render_faces[3 * at->nf + i] = at->nr + rf[i];
    for (i = 0; i < nr; i++)
        m->render_vertex[at->nr + i] = at->nv + (a->nr > 0 ? a->render_vertex[i] : i);
    if (a->nr > 0) memcpy(m->vt + 2 * at->nr, a->vt, 2 * sizeof(double) * (size_t)nr);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_mesh_merge(const cloth_hooks *hooks, cloth_mesh *const *meshes,
                                        int count, cloth_mesh **out) {
    double       nv = 0, nf = 0, npart = 0, nr = 0;
    int          i, with_X = 0, with_render = 0;
    cloth_mesh   at;
    cloth_status status = CLOTH_OK;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_mesh_merge: out is NULL");
    *out = NULL;
    if (!meshes || count < 1)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_mesh_merge: count = %i%s", count,
                           meshes ? "" : " and meshes is NULL");
    for (i = 0; i < count; i++) {
        const cloth_mesh *a = meshes[i];
        if (!a) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "meshes[%i] is NULL", i);
        nv += a->nv;
        nf += a->nf;
        npart += a->part ? a->npart : 1;
        nr += a->nr > 0 ? a->nr : a->nv;
        with_X |= a->X != NULL;
        with_render |= a->nr > 0;
    }
    if (nv > CLOTH_MAX_COUNT || nf > CLOTH_MAX_COUNT || npart > CLOTH_MAX_COUNT ||
        nr > 3.0 * CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "merged: %g vertices, %g faces, %g parts: at"
                           " most %i of each", nv, nf, npart, CLOTH_MAX_COUNT);
    *out = clothi_mesh_alloc(hooks, (int)nv, (int)nf, with_X, (int)npart,
                             with_render ? (int)nr : -1);
    if (!*out) return CLOTH_ERR_MEMORY;
    memset(&at, 0, sizeof at);
    for (i = 0; i < count && status == CLOTH_OK; i++) {
        const cloth_mesh *a = meshes[i];
        status = clothi_mesh_append(hooks, *out, a, &at);
        at.nv += a->nv;
        at.nf += a->nf;
        at.npart += a->part ? a->npart : 1;
        at.nr += a->nr > 0 ? a->nr : a->nv;
    }
    if (status != CLOTH_OK) {
        cloth_mesh_destroy(hooks, *out);
        *out = NULL;
    }
    return status;
}

/* ===== [4.4] REST SHAPE ========================================================================
 *
 *       X2 = (p, q)             Each triangle is its own flat piece; nothing ties neighbours
 *        /|\                    together, so any mesh, however curved, can be laid flat. l, p
 *       / | \                   and q are those of [4.1]. A frame per triangle is all that
 *      /  |  \                  the elements need: energies see lengths and angles only.
 *   X0----+---X1 = (l, 0)
 *
 * Two sweeps, the first of which only looks: X is written when all can be written.
 * checked: tests/test_rest.c */

CLOTH_API cloth_status cloth_flatten(int nv, const double *x, int nf, const int *faces,
                                     double *X) {
    clothi_triangle t;
    int             f, k, write;
    if (clothi_check_counts(NULL, nv, nf) != CLOTH_OK) return CLOTH_ERR_ARGUMENT;
    if ((nv > 0 && !x) || (nf > 0 && (!faces || !X))) return CLOTH_ERR_ARGUMENT;
    if (clothi_find_nonfinite(x, 3 * (size_t)nv) >= 0) return CLOTH_ERR_NONFINITE;
    for (write = 0; write < 2; write++) {
        for (f = 0; f < nf; f++) {
            const int *v = faces + 3 * f;
            double    *P = X + 6 * (size_t)f;
            for (k = 0; k < 3; k++)
                if (v[k] < 0 || v[k] >= nv) return CLOTH_ERR_MESH;
            if (!clothi_triangle_shape(x + 3 * v[0], x + 3 * v[1], x + 3 * v[2], &t))
                return CLOTH_ERR_MESH;
            if (!write) continue;
            P[0] = P[1] = P[3] = 0;
            P[2] = t.l;
            P[4] = t.p;
            P[5] = t.q;
        }
    }
    return CLOTH_OK;
}

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
