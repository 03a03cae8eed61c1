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

/* A triangle mesh in one block, owned by the caller: cloth_mesh_destroy frees it as one. The
 * arrays may be written, and X, part or nr set to NULL or 0 to leave them out.                */
typedef struct cloth_mesh {
    int     nv, nf;
    double *x;              /* [nv x 3] m                                                      */
    int    *faces;          /* [nf x 3] counter-clockwise seen from where the normals point    */
    double *X;              /* [nf x 3 x 2] m pattern coordinates of the corners, or NULL      */
    int     npart;          /* parts; 0 when part is NULL                                      */
    int    *part;           /* [nf] in [0, npart), or NULL                                     */
    int     nr;             /* render corners: distinct pairs of vertex and texture point; 0:
                               none, and the three arrays below are NULL                       */
    int    *render_vertex;  /* [nr] vertex of each render corner, in order of vertices         */
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

/* --- mesh: OBJ --- */

typedef enum cloth_obj_parts {
    CLOTH_OBJ_PARTS_NONE    = 0,    /* no part array                                           */
    CLOTH_OBJ_PARTS_OBJECTS = 1,    /* faces under one `o` name are a part                     */
    CLOTH_OBJ_PARTS_GROUPS  = 2,    /* faces under one `g` name are a part                     */
    CLOTH_OBJ_PARTS_FORCE_INT = 0x7fffffff
} cloth_obj_parts;

typedef struct cloth_obj_options {
    uint32_t        cookie;         /* set by cloth_obj_options_default                        */
    double          scale;          /* m per unit of v, > 0; default 1                         */
    double          pattern_scale;  /* m per unit of vt: > 0: vt become the pattern X, and every
                                       corner must have one; default 0: X stays NULL           */
    cloth_obj_parts parts;          /* default CLOTH_OBJ_PARTS_NONE                            */
} cloth_obj_options;

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

/* --- mesh: OBJ --- */

CLOTH_API cloth_obj_options cloth_obj_options_default(void);

/* Reads Wavefront OBJ text: v, vt, f (also o or g when asked); other keywords are skipped. [4.5]
 * Polygons are cut into fans about their first corner. Indices from 1, or negative: back from
 * the last one so far; 1, 1/2, 1//3, 1/2/3. LF, CRLF or CR; # comments; \ at a line's end goes on.
 * Numbers are rounded correctly whatever their length; the locale plays no part.
 * in   text     [size] bytes, need not end in 0
 * in   options  NULL: cloth_obj_options_default()
 * out  *out     owned: cloth_mesh_destroy; NULL on failure
 * returns CLOTH_OK; CLOTH_ERR_PARSE: the sentence names the line (no faces; fewer than 3 numbers
 *   or corners; no number; NaN, infinite or too large; index 0 or out of range);
 *   CLOTH_ERR_ARGUMENT; CLOTH_ERR_UNINIT; CLOTH_ERR_CAPACITY: over CLOTH_MAX_COUNT of a kind;
 *   CLOTH_ERR_MEMORY. Whether the mesh can be simulated is for cloth_mesh_check.
 * contract: alloc the mesh and scratch | cost O(size): 0.02 us a number of up to 15
 *   digits, 0.5 us a longer one */
CLOTH_API cloth_status cloth_obj_parse(const cloth_hooks *hooks, const char *text, size_t size,
                                       const cloth_obj_options *options, cloth_mesh **out);

/* cloth_obj_parse of a file. Also CLOTH_ERR_IO; CLOTH_ERR_UNSUPPORTED under CLOTH_NO_STDIO. */
CLOTH_API cloth_status cloth_obj_load(const cloth_hooks *hooks, const char *path,
                                      const cloth_obj_options *options, cloth_mesh **out);

/* Writes a mesh as OBJ text, each number in the fewest digits that read back as the same double.
 * vt: the render corners; without them the pattern X, if any (read it with pattern_scale 1).
 * Parts become `g part0`, `g part1`, ... Call once with buf NULL for the size, then again.
 * out  buf     [capacity], no 0 at the end; NULL: only *needed
 * out  needed  bytes of the text, may be NULL
 * returns CLOTH_OK; CLOTH_ERR_CAPACITY: buf holds the first `capacity` bytes; CLOTH_ERR_ARGUMENT:
 *   NULL, an index of the mesh out of range; CLOTH_ERR_NONFINITE; CLOTH_ERR_MEMORY
 * contract: alloc scratch [nv] | cost O(size), 0.15 to 0.5 us a number */
CLOTH_API cloth_status cloth_obj_format(const cloth_hooks *hooks, const cloth_mesh *mesh,
                                        char *buf, size_t capacity, size_t *needed);

/* cloth_obj_format into a file. Also CLOTH_ERR_IO (what was written so far may be left);
 * CLOTH_ERR_UNSUPPORTED under CLOTH_NO_STDIO. */
CLOTH_API cloth_status cloth_obj_save(const cloth_hooks *hooks, const char *path,
                                      const cloth_mesh *mesh);

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
/* @@ CLOTH_NO_STDIO: no <stdio.h>; calls that take a path return CLOTH_ERR_UNSUPPORTED
 *    (implementation file only). */
#ifndef CLOTH_NO_STDIO
#  include <stdio.h>
#endif
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

/* ===== [4.5] OBJ FILES =========================================================================
 *
 *   text --- lines, tokens ---> statements --- twice ---> counts, then arrays ---> cloth_mesh
 *   decimal digits  <--- big integers --->  double
 *
 * Numbers. libc's strtod and printf follow the locale (a German one reads 0,5), so the two
 * conversions are our own. Both are exact arithmetic on integers.
 *   Reading: the text is D 10^e. Up to 15 digits and |e| <= 22 both factors are doubles, and one
 *   multiplication or division rounds once: done [Cli90]. Otherwise N/M = D 10^e as integers,
 *   shifted by 2^b until N/M is in (1/2, 2); 64 steps of long division give 64 bits and a
 *   remainder; one rounding, half to even, also for subnormals. 800 digits decide every case (a
 *   midpoint between doubles has at most 768); what follows them only counts as 'not zero'.
 *   Writing: digits of v = R/S are generated until what is left is below half the distance to a
 *   neighbour; then any reader that rounds correctly returns to v: the fewest digits that do,
 *   at most 17 [SW90].
 * Reading runs over the text twice, first to count: one allocation of the right size, and an
 * index is checked where it stands, so that the sentence can name its line.
 * Render corners: distinct (vertex, vt) pairs by two counting sorts of the corners.
 * [Cli90] Clinger, How to read floating point numbers accurately, PLDI 1990,
 * doi:10.1145/93542.93557. [SW90] Steele and White, How to print floating-point numbers
 * accurately, PLDI 1990, doi:10.1145/93542.93559.
 * checked: tests/test_obj.c, tests/fuzz_mesh.c */

/* A natural number: n words, least first, no zero at the top. Reading needs 10^1131 2^2, that is
 * 3760 bits; writing 2^1130. */
#define CLOTHI_BIG_WORDS 128

typedef struct clothi_big {
    int      n;
    uint32_t w[CLOTHI_BIG_WORDS];
} clothi_big;

static void clothi_big_set(clothi_big *a, uint64_t u) {
    a->w[0] = (uint32_t)(u & 0xffffffffu);
    a->w[1] = (uint32_t)(u >> 32);
    a->n = a->w[1] ? 2 : a->w[0] ? 1 : 0;
}

/* a = a m + c */
static void clothi_big_mul(clothi_big *a, uint32_t m, uint32_t c) {
    uint64_t carry = c;
    int      i;
    for (i = 0; i < a->n; i++) {
        carry += (uint64_t)a->w[i] * m;
        a->w[i] = (uint32_t)(carry & 0xffffffffu);
        carry >>= 32;
    }
    if (carry) a->w[a->n++] = (uint32_t)carry;
    CLOTH_ASSERT(a->n < CLOTHI_BIG_WORDS);
}

static void clothi_big_mul_pow10(clothi_big *a, int e) {
    for (; e >= 9; e -= 9) clothi_big_mul(a, 1000000000u, 0);
    for (; e > 0; e--) clothi_big_mul(a, 10u, 0);
}

static void clothi_big_shift(clothi_big *a, int bits) {
    const int words = bits / 32, rest = bits % 32;
    int       i;
    if (a->n == 0) return;
    CLOTH_ASSERT(a->n + words + 1 < CLOTHI_BIG_WORDS);
    for (i = a->n - 1; i >= 0; i--) a->w[i + words] = a->w[i];
    for (i = 0; i < words; i++) a->w[i] = 0;
    a->n += words;
    if (rest) clothi_big_mul(a, (uint32_t)1 << rest, 0);
}

static int clothi_big_bits(const clothi_big *a) {
    uint32_t top = a->n ? a->w[a->n - 1] : 0;
    int      bits = 32 * (a->n ? a->n - 1 : 0);
    for (; top; top >>= 1) bits++;
    return bits;
}

static int clothi_big_compare(const clothi_big *a, const clothi_big *b) {
    int i;
    if (a->n != b->n) return a->n < b->n ? -1 : 1;
    for (i = a->n - 1; i >= 0; i--)
        if (a->w[i] != b->w[i]) return a->w[i] < b->w[i] ? -1 : 1;
    return 0;
}

/* a -= b, b <= a */
static void clothi_big_sub(clothi_big *a, const clothi_big *b) {
    uint64_t borrow = 0;
    int      i;
    for (i = 0; i < a->n; i++) {
        const uint64_t s = borrow + (i < b->n ? b->w[i] : 0u);
        borrow = a->w[i] < s;
        a->w[i] = (uint32_t)((a->w[i] + (borrow << 32) - s) & 0xffffffffu);
    }
    while (a->n > 0 && a->w[a->n - 1] == 0) a->n--;
}

/* a + b compared with c */
static int clothi_big_compare_sum(const clothi_big *a, const clothi_big *b, const clothi_big *c) {
    clothi_big sum;
    uint64_t   carry = 0;
    const int  n = a->n > b->n ? a->n : b->n;
    int        i;
    for (i = 0; i < n; i++) {
        carry += (uint64_t)(i < a->n ? a->w[i] : 0u) + (i < b->n ? b->w[i] : 0u);
        sum.w[i] = (uint32_t)(carry & 0xffffffffu);
        carry >>= 32;
    }
    sum.n = n;
    if (carry) sum.w[sum.n++] = (uint32_t)carry;
    return clothi_big_compare(&sum, c);
}

/* --- reading a number --- */

#define CLOTHI_DIGITS 800

/* 0.d0 d1 d2 ... times 10^point; d0 != 0; n = 0: zero. */
typedef struct clothi_decimal {
    int           negative, n;
    int64_t       point;
    unsigned char d[CLOTHI_DIGITS + 1];
} clothi_decimal;

static int clothi_is_digit(char c) { return c >= '0' && c <= '9'; }

/* Reads [+-] digits [. digits] [e [+-] digits]; 1 when the n bytes are that and no more. */
static int clothi_decimal_scan(const char *s, size_t n, clothi_decimal *d) {
    const char *end = s + n;
    int64_t     exponent = 0;
    int         any = 0, after_point = 0, minus = 0, more = 0;
    d->negative = d->n = 0;
    d->point = 0;
    if (s < end && (*s == '+' || *s == '-')) d->negative = *s++ == '-';
    for (; s < end; s++) {
        if (*s == '.' && !after_point) {
            after_point = 1;
            continue;
        }
        if (!clothi_is_digit(*s)) break;
        any = 1;
        if (d->n > 0 || *s != '0') {
            if (d->n < CLOTHI_DIGITS) d->d[d->n++] = (unsigned char)(*s - '0');
            else more |= *s != '0';
            d->point += !after_point;
        } else {
            d->point -= after_point;
        }
    }
    if (more) d->d[d->n++] = 1;
    if (!any) return 0;
    if (s < end && (*s == 'e' || *s == 'E')) {
        s++;
        if (s < end && (*s == '+' || *s == '-')) minus = *s++ == '-';
        if (s == end) return 0;
        for (; s < end && clothi_is_digit(*s); s++)
            if (exponent < 1000000000000000) exponent = 10 * exponent + (*s - '0');
        d->point += minus ? -exponent : exponent;
    }
    return s == end;
}

/* The double nearest to q 2^e (plus less than one unit of q when more != 0); q has 63 or 64 bits.
 * Bits are put together by hand: rounding up may carry into the exponent, as it should. */
static double clothi_round_to_double(uint64_t q, int e, int more, int negative) {
    const int top = (q >> 63) ? 64 : 63, lead = e + top - 1;        /* 2^lead <= value */
    const int bits = lead >= -1022 ? 53 : lead + 1075;
    uint64_t  kept, rest, half, out;
    double    a;
    if (lead > 1023) {
        out = (uint64_t)0x7ff << 52;
    } else if (bits < 0) {
        out = 0;
    } else {
        const int drop = top - bits;                                /* 10 .. 64 */
        half = (uint64_t)1 << (drop - 1);
        kept = drop == 64 ? 0 : q >> drop;
        rest = drop == 64 ? q : q & (((uint64_t)1 << drop) - 1u);
        kept += rest > half || (rest == half && (more || (kept & 1u)));
        out = lead >= -1022 ? ((uint64_t)(lead + 1022) << 52) + kept : kept;
    }
    out |= (uint64_t)(negative != 0) << 63;
    memcpy(&a, &out, sizeof a);
    return a;
}

static double clothi_decimal_exact(const clothi_decimal *d) {
    clothi_big num, den;
    uint64_t   q = 0;
    int        i, b, exponent = (int)d->point - d->n;
    clothi_big_set(&num, 0);
    clothi_big_set(&den, 1);
    for (i = 0; i < d->n; i++) clothi_big_mul(&num, 10u, d->d[i]);
    clothi_big_mul_pow10(exponent >= 0 ? &num : &den, exponent >= 0 ? exponent : -exponent);
    b = clothi_big_bits(&num) - clothi_big_bits(&den);
    clothi_big_shift(b < 0 ? &num : &den, b < 0 ? -b : b);          /* now in (1/2, 2) */
    for (i = 0; i < 64; i++) {
        q <<= 1;
        if (clothi_big_compare(&num, &den) >= 0) {
            clothi_big_sub(&num, &den);
            q |= 1u;
        }
        clothi_big_shift(&num, 1);
    }
    return clothi_round_to_double(q, b - 63, num.n > 0, d->negative);
}

/* 1 and the nearest double (infinite when too large) when the n bytes are a decimal number. */
static int clothi_parse_double(const char *s, size_t n, double *out) {
    static const double tens[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                  1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                  1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    clothi_decimal d;
    if (!clothi_decimal_scan(s, n, &d)) return 0;
    if (d.n == 0 || d.point < -330) {
        *out = clothi_round_to_double((uint64_t)1 << 63, -2000, 0, d.negative);
        return 1;
    }
    if (d.point > 310) {
        *out = clothi_round_to_double((uint64_t)1 << 63, 2000, 0, d.negative);
        return 1;
    }
#if !defined(__FLT_EVAL_METHOD__) || __FLT_EVAL_METHOD__ == 0
    if (d.n <= 15 && d.point - d.n >= -22 && d.point - d.n <= 22) {
        double a = 0;
        int    i, exponent = (int)d.point - d.n;
        for (i = 0; i < d.n; i++) a = 10 * a + d.d[i];
        a = exponent < 0 ? a / tens[-exponent] : a * tens[exponent];
        *out = d.negative ? -a : a;
        return 1;
    }
#else
    (void)tens;
#endif
    *out = clothi_decimal_exact(&d);
    return 1;
}

/* --- writing a number --- */

/* Where text goes: counted beyond the capacity, kept within. */
typedef struct clothi_sink {
    char  *buf;
    size_t capacity, n;
} clothi_sink;

static void clothi_sink_char(clothi_sink *s, char c) {
    if (s->n < s->capacity) s->buf[s->n] = c;
    s->n++;
}

static void clothi_sink_string(clothi_sink *s, const char *text) {
    while (*text) clothi_sink_char(s, *text++);
}

static void clothi_sink_int(clothi_sink *s, int i) {
    char digits[12];
    int  n = 0;
    if (i < 0) clothi_sink_char(s, '-');
    do {
        digits[n++] = (char)('0' + (i < 0 ? -(i % 10) : i % 10));
        i /= 10;
    } while (i);
    while (n) clothi_sink_char(s, digits[--n]);
}

/* The fewest digits (at most 17) of a > 0, finite, that read back as a: a = 0.d0 d1 .. 10^point. */
static int clothi_shortest_digits(double a, unsigned char *digits, int *point) {
    clothi_big r, s, below, above;          /* a = r/s; distances to the neighbours' midpoints */
    uint64_t   bits, f;
    int        e, k, n = 0, edge, even, low, high;
    memcpy(&bits, &a, sizeof bits);
    f = bits & (((uint64_t)1 << 52) - 1u);
    e = (int)(bits >> 52 & 0x7ffu);
    edge = f == 0 && e > 1;                 /* a power of two: its lower neighbour is nearer   */
    f |= (uint64_t)(e > 0) << 52;
    e = (e > 0 ? e : 1) - 1075;             /* a = f 2^e                                       */
    even = (f & 1u) == 0;                   /* a midpoint itself reads back as an even f       */
    clothi_big_set(&r, f);
    clothi_big_set(&s, 1);
    clothi_big_set(&below, 1);
    clothi_big_set(&above, 1);
    clothi_big_shift(&r, (e > 0 ? e : 0) + 1 + edge);
    clothi_big_shift(&s, (e < 0 ? -e : 0) + 1 + edge);
    clothi_big_shift(&below, e > 0 ? e : 0);
    clothi_big_shift(&above, (e > 0 ? e : 0) + edge);
    k = (int)ceil(log10(a) - 1e-10);        /* right or one too small                          */
    clothi_big_mul_pow10(&s, k > 0 ? k : 0);
    clothi_big_mul_pow10(&r, k < 0 ? -k : 0);
    clothi_big_mul_pow10(&below, k < 0 ? -k : 0);
    clothi_big_mul_pow10(&above, k < 0 ? -k : 0);
    if (clothi_big_compare_sum(&r, &above, &s) >= !even) {
        clothi_big_mul(&s, 10u, 0);
        k++;
    }
    do {
        int d = 0;
        clothi_big_mul(&r, 10u, 0);
        clothi_big_mul(&below, 10u, 0);
        clothi_big_mul(&above, 10u, 0);
        for (; clothi_big_compare(&r, &s) >= 0; d++) clothi_big_sub(&r, &s);
        low = clothi_big_compare(&r, &below) < even;
        high = clothi_big_compare_sum(&r, &above, &s) >= !even;
        if (high && (!low || clothi_big_compare_sum(&r, &r, &s) >= 0)) d++;
        digits[n++] = (unsigned char)d;
    } while (!low && !high);
    *point = k;
    return n;
}

/* A finite double, plain between 1e-5 and 1e17, else d.dde-7. */
static void clothi_sink_double(clothi_sink *s, double a) {
    unsigned char d[24];
    int           i, n, point;
    uint64_t      bits;
    memcpy(&bits, &a, sizeof bits);
    if (bits >> 63) clothi_sink_char(s, '-');
    if (!(fabs(a) > 0)) {
        clothi_sink_char(s, '0');
        return;
    }
    n = clothi_shortest_digits(fabs(a), d, &point);
    if (point > -5 && point <= 17) {
        if (point <= 0) clothi_sink_string(s, "0.");
        for (i = point; i < 0; i++) clothi_sink_char(s, '0');
        for (i = 0; i < n || i < point; i++) {
            if (i > 0 && i == point) clothi_sink_char(s, '.');
            clothi_sink_char(s, (char)('0' + (i < n ? d[i] : 0)));
        }
        return;
    }
    clothi_sink_char(s, (char)('0' + d[0]));
    if (n > 1) clothi_sink_char(s, '.');
    for (i = 1; i < n; i++) clothi_sink_char(s, (char)('0' + d[i]));
    clothi_sink_char(s, 'e');
    clothi_sink_int(s, point - 1);
}

/* --- reading the text --- */

#define CLOTHI_OBJ_COOKIE 0x0b1c10f7u

typedef struct clothi_obj_name {
    const char *s;
    size_t      n;
} clothi_obj_name;

typedef struct clothi_obj {
    const cloth_hooks *hooks;
    cloth_obj_options  opt;
    const char *p, *end;    /* the rest of the text                                            */
    int     line;           /* of p, from 1                                                    */
    int     nv, nvt, nf, nname;                     /* totals, from the first run              */
    int     v, t, f;                                /* so far, in the second run               */
    double *x;              /* [nv x 3]                                                        */
    double *vt;             /* [nvt x 2]                                                       */
    int    *faces;          /* [nf x 3]                                                        */
    int    *corner_vt;      /* [nf x 3] -1: none                                               */
    int    *part;           /* [nf]                                                            */
    clothi_obj_name *names; /* [nname + 1] of the parts                                        */
    int    *table;          /* [table_size] open hash: part + 1, 0 empty                       */
    size_t  table_size;
    clothi_obj_name name;   /* in force                                                        */
    int     npart, current; /* parts so far; part of `name`, -1: not yet looked up             */
} clothi_obj;

CLOTH_API cloth_obj_options cloth_obj_options_default(void) {
    cloth_obj_options o;
    memset(&o, 0, sizeof o);
    o.cookie = CLOTHI_OBJ_COOKIE;
    o.scale = 1.0;
    o.parts = CLOTH_OBJ_PARTS_NONE;
    return o;
}

/* Bytes of the line end at p: 0, 1 or 2. */
static int clothi_obj_eol(const clothi_obj *o, const char *p) {
    if (p == o->end) return 0;
    if (*p == '\r') return p + 1 < o->end && p[1] == '\n' ? 2 : 1;
    return *p == '\n';
}

/* Bytes of a continuation at p, a backslash and a line end: 0, 2 or 3. */
static int clothi_obj_goes_on(const clothi_obj *o, const char *p) {
    const int eol = p < o->end && *p == '\\' ? clothi_obj_eol(o, p + 1) : 0;
    return eol ? 1 + eol : 0;
}

static void clothi_obj_count_line(clothi_obj *o) { o->line += o->line < 0x7fffffff; }

static int clothi_obj_is_blank(char c) {
    return c == ' ' || c == '\t' || c == '\v' || c == '\f';
}

/* The next token of this line; 0 at its end or at a comment. */
static int clothi_obj_token(clothi_obj *o, clothi_obj_name *token) {
    while (o->p < o->end) {
        const int n = clothi_obj_goes_on(o, o->p);
        if (n) clothi_obj_count_line(o);
        else if (!clothi_obj_is_blank(*o->p)) break;
        o->p += n ? n : 1;
    }
    token->s = o->p;
    while (o->p < o->end && !clothi_obj_is_blank(*o->p) && *o->p != '#' &&
           !clothi_obj_eol(o, o->p) && !clothi_obj_goes_on(o, o->p))
        o->p++;
    token->n = (size_t)(o->p - token->s);
    return token->n > 0;
}

static void clothi_obj_skip_line(clothi_obj *o) {
    int comment = 0;
    while (o->p < o->end) {
        int n = clothi_obj_eol(o, o->p);
        if (n) {
            o->p += n;
            clothi_obj_count_line(o);
            return;
        }
        if (*o->p == '#') comment = 1;
        n = comment ? 0 : clothi_obj_goes_on(o, o->p);
        if (n) clothi_obj_count_line(o);
        o->p += n ? n : 1;
    }
}

static int clothi_obj_is(const clothi_obj_name *token, const char *word) {
    return token->n == strlen(word) && memcmp(token->s, word, token->n) == 0;
}

/* A piece of the text for a sentence: at most 31 bytes, printable. */
static const char *clothi_obj_quote(const clothi_obj_name *token, char *out) {
    size_t i;
    for (i = 0; i < 31 && i < token->n; i++)
        out[i] = token->s[i] >= ' ' && token->s[i] <= '~' ? token->s[i] : '?';
    out[i] = '\0';
    return out;
}

/* Up to n numbers of this line into out, of which `least` must be there. */
static cloth_status clothi_obj_numbers(clothi_obj *o, const char *keyword, int n, int least,
                                       double *out) {
    char quote[32];
    int  i;
    for (i = 0; i < n; i++) {
        clothi_obj_name token;
        if (!clothi_obj_token(o, &token)) {
            if (i >= least) return CLOTH_OK;
            return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: %s has %i numbers but needs "
                               "%i", o->line, keyword, i, least);
        }
        if (!clothi_parse_double(token.s, token.n, out + i))
            return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: %s: '%s' is not a number",
                               o->line, keyword, clothi_obj_quote(&token, quote));
        if (!clothi_finite(out[i]))
            return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: %s: '%s' is too large",
                               o->line, keyword, clothi_obj_quote(&token, quote));
    }
    return CLOTH_OK;
}

static cloth_status clothi_obj_vertex(clothi_obj *o) {
    double      *p = o->x + 3 * o->v;
    int          k;
    cloth_status status = clothi_obj_numbers(o, "v", 3, 3, p);
    if (status != CLOTH_OK) return status;
    for (k = 0; k < 3; k++) {
        p[k] *= o->opt.scale;
        if (!clothi_finite(p[k]))
            return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: v times scale %g is too large",
                               o->line, o->opt.scale);
    }
    o->v++;
    return CLOTH_OK;
}

/* An index of a corner at *s: 1 and *out (0: empty, up to the next slash) or 0: no integer. */
static int clothi_obj_index(const char **s, const char *end, long long *out) {
    int minus = 0;
    *out = 0;
    if (*s == end || **s == '/') return 1;
    if (**s == '+' || **s == '-') minus = *(*s)++ == '-';
    if (*s == end || !clothi_is_digit(**s)) return 0;
    for (; *s < end && clothi_is_digit(**s); ++*s)
        if (*out < 1000000000000) *out = 10 * *out + (**s - '0');
    if (*out == 0) *out = 1000000000000;    /* index 0 is out of range, not empty              */
    if (minus) *out = -*out;
    return *s == end || **s == '/';
}

/* An OBJ index to ours, -1 when out of range: from 1, or from the last of `so_far`. */
static int clothi_obj_resolve(long long i, int so_far, int total) {
    if (i > 0) return i <= total ? (int)(i - 1) : -1;
    return i < 0 && -i <= so_far ? (int)(so_far + i) : -1;
}

/* v, v/vt, v//vn or v/vt/vn; any of vt and vn may be empty. */
static cloth_status clothi_obj_corner(clothi_obj *o, const clothi_obj_name *token, int *vertex,
                                      int *texture) {
    const char *s = token->s, *end = s + token->n;
    long long   index[3] = {0, 0, 0};
    char        quote[32];
    int         n = 0, ok;
    do {
        ok = clothi_obj_index(&s, end, &index[n++]);
    } while (ok && n < 3 && s < end && *s++ == '/');
    if (!ok || s != end || index[0] == 0)
        return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: '%s' is not a face corner "
                           "v/vt/vn", o->line, clothi_obj_quote(token, quote));
    *vertex = clothi_obj_resolve(index[0], o->v, o->nv);
    if (*vertex < 0)
        return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: '%s': no such vertex; %i of %i "
                           "have been given", o->line, clothi_obj_quote(token, quote), o->v,
                           o->nv);
    *texture = -1;
    if (index[1] == 0 && o->opt.pattern_scale > 0)
        return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: '%s' has no vt, but pattern_scale "
                           "= %g asks for a pattern", o->line, clothi_obj_quote(token, quote),
                           o->opt.pattern_scale);
    if (index[1] == 0) return CLOTH_OK;
    *texture = clothi_obj_resolve(index[1], o->t, o->nvt);
    if (*texture < 0)
        return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: '%s': no such vt; %i of %i have "
                           "been given", o->line, clothi_obj_quote(token, quote), o->t, o->nvt);
    return CLOTH_OK;
}

/* The part of the name in force; a new one gets the next number. */
static int clothi_obj_find_part(clothi_obj *o) {
    uint64_t hash = 0xcbf29ce484222325u;                            /* FNV-1a */
    size_t   i;
    for (i = 0; i < o->name.n; i++)
        hash = (hash ^ (unsigned char)o->name.s[i]) * 0x100000001b3u;
    for (i = (size_t)(hash ^ hash >> 32) % o->table_size; o->table[i];
         i = (i + 1u) % o->table_size) {
        const clothi_obj_name *n = o->names + (o->table[i] - 1);
        if (n->n == o->name.n && (n->n == 0 || memcmp(n->s, o->name.s, n->n) == 0))
            return o->table[i] - 1;
    }
    o->names[o->npart] = o->name;
    o->table[i] = ++o->npart;
    return o->npart - 1;
}

static cloth_status clothi_obj_face(clothi_obj *o) {
    int             first[2] = {0, 0}, last[2] = {0, 0}, now[2], n = 0;
    clothi_obj_name token;
    for (; clothi_obj_token(o, &token); n++) {
        cloth_status status = clothi_obj_corner(o, &token, &now[0], &now[1]);
        if (status != CLOTH_OK) return status;
        if (n == 0) memcpy(first, now, sizeof now);
        if (n >= 2) {
            int *v = o->faces + 3 * o->f, *t = o->corner_vt + 3 * o->f;
            v[0] = first[0];
            v[1] = last[0];
            v[2] = now[0];
            t[0] = first[1];
            t[1] = last[1];
            t[2] = now[1];
            if (o->current < 0) o->current = clothi_obj_find_part(o);
            o->part[o->f++] = o->current;
        }
        memcpy(last, now, sizeof now);
    }
    if (n < 3)
        return clothi_fail(o->hooks, CLOTH_ERR_PARSE, "line %i: f has %i corners but needs 3",
                           o->line, n);
    return CLOTH_OK;
}

/* The rest of the line, blanks at its ends left out, is the name of the faces that follow. */
static void clothi_obj_set_name(clothi_obj *o) {
    clothi_obj_name token;
    o->current = -1;
    o->name.n = 0;
    if (!clothi_obj_token(o, &token)) return;
    o->name.s = token.s;
    do o->name.n = (size_t)(token.s + token.n - o->name.s);
    while (clothi_obj_token(o, &token));
}

static int clothi_obj_names_part(const clothi_obj *o, const clothi_obj_name *keyword) {
    return (o->opt.parts == CLOTH_OBJ_PARTS_OBJECTS && clothi_obj_is(keyword, "o")) ||
           (o->opt.parts == CLOTH_OBJ_PARTS_GROUPS && clothi_obj_is(keyword, "g"));
}

static void clothi_obj_rewind(clothi_obj *o, const char *text, size_t size) {
    o->p = text;
    o->end = text + size;
    o->line = 1;
    if (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) o->p += 3;        /* byte order mark */
}

/* First run: totals. */
static cloth_status clothi_obj_count(clothi_obj *o) {
    for (; o->p < o->end; clothi_obj_skip_line(o)) {
        clothi_obj_name keyword, token;
        if (!clothi_obj_token(o, &keyword)) continue;
        if (clothi_obj_is(&keyword, "v")) o->nv++;
        else if (clothi_obj_is(&keyword, "vt")) o->nvt++;
        else if (clothi_obj_names_part(o, &keyword)) o->nname++;
        else if (clothi_obj_is(&keyword, "f")) {
            int n = 0;
            while (o->nf <= CLOTH_MAX_COUNT && clothi_obj_token(o, &token)) o->nf += ++n >= 3;
        }
        if (o->nv > CLOTH_MAX_COUNT || o->nvt > CLOTH_MAX_COUNT || o->nf > CLOTH_MAX_COUNT ||
            o->nname >= CLOTH_MAX_COUNT)
            return clothi_fail(o->hooks, CLOTH_ERR_CAPACITY, "line %i: more than %i of a kind",
                               o->line, CLOTH_MAX_COUNT);
    }
    return CLOTH_OK;
}

static cloth_status clothi_obj_read(clothi_obj *o) {
    cloth_status status = CLOTH_OK;
    for (; o->p < o->end && status == CLOTH_OK; clothi_obj_skip_line(o)) {
        clothi_obj_name keyword;
        if (!clothi_obj_token(o, &keyword)) continue;
        if (clothi_obj_is(&keyword, "v")) {
            status = clothi_obj_vertex(o);
        } else if (clothi_obj_is(&keyword, "vt")) {
            o->vt[2 * o->t + 1] = 0;
            status = clothi_obj_numbers(o, "vt", 2, 1, o->vt + 2 * o->t);
            o->t++;
        } else if (clothi_obj_is(&keyword, "f")) {
            status = clothi_obj_face(o);
        } else if (clothi_obj_names_part(o, &keyword)) {
            clothi_obj_set_name(o);
        }
    }
    return status;
}

/* Arrays for the second run, in two blocks: doubles, ints. */
static cloth_status clothi_obj_alloc(clothi_obj *o) {
    const size_t v = (size_t)o->nv, t = (size_t)o->nvt, f = (size_t)o->nf;
    o->table_size = 2 * (size_t)o->nname + 3u;
    o->x = (double *)clothi_alloc(o->hooks, 3 * v + 2 * t, sizeof(double));
    o->faces = (int *)clothi_alloc(o->hooks, 7 * f + o->table_size, sizeof(int));
    o->names = (clothi_obj_name *)clothi_alloc(o->hooks, (size_t)o->nname + 1u,
                                               sizeof(clothi_obj_name));
    if (!o->x || !o->faces || !o->names)
        return clothi_fail(o->hooks, CLOTH_ERR_MEMORY, "no memory to read %i vertices and %i "
                           "faces", o->nv, o->nf);
    o->vt = o->x + 3 * v;
    o->corner_vt = o->faces + 3 * f;
    o->part = o->corner_vt + 3 * f;
    o->table = o->part + f;
    return CLOTH_OK;
}

/* Fills the render corners of a mesh whose order [3 nf] lists corners by (vertex, vt). mesh NULL:
 * only the number of them. */
static int clothi_obj_render(const clothi_obj *o, const int *order, cloth_mesh *mesh) {
    int i, nr = 0;
    for (i = 0; i < 3 * o->nf; i++) {
        const int c = order[i], v = o->faces[c], t = o->corner_vt[c];
        if (i == 0 || v != o->faces[order[i - 1]] || t != o->corner_vt[order[i - 1]]) {
            if (mesh) mesh->render_vertex[nr] = v;
            if (mesh && t >= 0) memcpy(mesh->vt + 2 * nr, o->vt + 2 * t, 2 * sizeof(double));
            nr++;
        }
        if (mesh) mesh->render_faces[c] = nr - 1;
    }
    return nr;
}

static cloth_status clothi_obj_finish(clothi_obj *o, cloth_mesh **out) {
    const int    n = 3 * o->nf, keys = (o->nv > o->nvt ? o->nv : o->nvt) + 1;
    const int    with_X = o->opt.pattern_scale > 0;
    int          i, nr = -1, *order = NULL, *work, *count;
    cloth_mesh  *m;
    cloth_status status = CLOTH_OK;
    if (o->nvt > 0) {
        order = (int *)clothi_alloc(o->hooks, 2 * (size_t)n + (size_t)keys + 1u, sizeof(int));
        if (!order)
            return clothi_fail(o->hooks, CLOTH_ERR_MEMORY, "no memory for render corners");
        work = order + n;
        count = work + n;
        for (i = 0; i < n; i++) o->corner_vt[i]++;                  /* keys from 0 */
        clothi_sort_by(n, keys, o->corner_vt, NULL, work, count);
        clothi_sort_by(n, keys, o->faces, work, order, count);
        for (i = 0; i < n; i++) o->corner_vt[i]--;
        nr = clothi_obj_render(o, order, NULL);
    }
    m = clothi_mesh_alloc(o->hooks, o->nv, o->nf, with_X,
                          o->opt.parts == CLOTH_OBJ_PARTS_NONE ? 0 : o->npart, nr);
    if (!m) {
        status = CLOTH_ERR_MEMORY;
        goto done;
    }
    memcpy(m->x, o->x, 3 * sizeof(double) * (size_t)o->nv);
    memcpy(m->faces, o->faces, sizeof(int) * (size_t)n);
    if (m->part) memcpy(m->part, o->part, sizeof(int) * (size_t)o->nf);
    if (nr > 0) clothi_obj_render(o, order, m);
    for (i = 0; with_X && i < 2 * n; i++) {
        m->X[i] = o->opt.pattern_scale * o->vt[2 * o->corner_vt[i / 2] + i % 2];
        if (!clothi_finite(m->X[i])) {
            status = clothi_fail(o->hooks, CLOTH_ERR_PARSE, "face %i: vt times pattern_scale %g is"
                                 " too large", i / 6, o->opt.pattern_scale);
            goto done;
        }
    }
    *out = m;
    m = NULL;
done:
    cloth_mesh_destroy(o->hooks, m);
    clothi_free(o->hooks, order);
    return status;
}

static cloth_status clothi_obj_check_options(const cloth_hooks *hooks,
                                             const cloth_obj_options *o) {
    if (o->cookie != CLOTHI_OBJ_COOKIE)
        return clothi_fail(hooks, CLOTH_ERR_UNINIT, "options are not from "
                           "cloth_obj_options_default()");
    if (o->parts != CLOTH_OBJ_PARTS_NONE && o->parts != CLOTH_OBJ_PARTS_OBJECTS &&
        o->parts != CLOTH_OBJ_PARTS_GROUPS)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.parts = %i is none of "
                           "CLOTH_OBJ_PARTS_", (int)o->parts);
    if (!clothi_finite(o->pattern_scale) || o->pattern_scale < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.pattern_scale = %g must be finite "
                           "and >= 0", o->pattern_scale);
    return clothi_check_size(hooks, "options.scale", o->scale);
}

CLOTH_API cloth_status cloth_obj_parse(const cloth_hooks *hooks, const char *text, size_t size,
                                       const cloth_obj_options *options, cloth_mesh **out) {
    clothi_obj   o;
    cloth_status status;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_parse: out is NULL");
    *out = NULL;
    if (!text) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_parse: text is NULL");
    memset(&o, 0, sizeof o);
    o.hooks = hooks;
    o.opt = options ? *options : cloth_obj_options_default();
    o.current = -1;
    status = clothi_obj_check_options(hooks, &o.opt);
    if (status != CLOTH_OK) return status;
    clothi_obj_rewind(&o, text, size);
    status = clothi_obj_count(&o);
    if (status != CLOTH_OK) return status;
    if (o.nv == 0)
        return clothi_fail(hooks, CLOTH_ERR_PARSE, "%i lines, %z bytes: no vertex (v)", o.line,
                           size);
    status = clothi_obj_alloc(&o);
    if (status != CLOTH_OK) goto done;
    clothi_obj_rewind(&o, text, size);
    status = clothi_obj_read(&o);
    if (status != CLOTH_OK) goto done;
    if (o.nf == 0)
        status = clothi_fail(hooks, CLOTH_ERR_PARSE, "%i lines, %i vertices: no face (f)", o.line,
                             o.nv);
    else
        status = clothi_obj_finish(&o, out);
done:
    clothi_free(hooks, o.x);
    clothi_free(hooks, o.faces);
    clothi_free(hooks, o.names);
    return status;
}

/* --- writing the text --- */

static void clothi_obj_write_numbers(clothi_sink *s, const char *keyword, const double *a,
                                     int n) {
    int k;
    clothi_sink_string(s, keyword);
    for (k = 0; k < n; k++) {
        clothi_sink_char(s, ' ');
        clothi_sink_double(s, a[k]);
    }
    clothi_sink_char(s, '\n');
}

/* The pattern as vt: a corner with the same numbers as the last vt of its vertex shares it. True
 * when corner starts a vt of its own, number ++*n. last, last_corner [nv] are kept in between. */
static int clothi_obj_new_pattern_vt(const cloth_mesh *m, int *last, int *last_corner, int corner,
                                     int *n) {
    const int v = m->faces[corner];
    if (last[v] > 0 && memcmp(m->X + 2 * (size_t)last_corner[v], m->X + 2 * (size_t)corner,
                              2 * sizeof(double)) == 0)
        return 0;
    last[v] = ++*n;
    last_corner[v] = corner;
    return 1;
}

static void clothi_obj_write(const cloth_mesh *m, int *last, clothi_sink *s) {
    const int pattern = m->nr == 0 && m->X != NULL;
    int      *corner = last ? last + m->nv : NULL;
    int       i, n = 0;
    for (i = 0; i < m->nv; i++) clothi_obj_write_numbers(s, "v", m->x + 3 * i, 3);
    for (i = 0; i < m->nr; i++) clothi_obj_write_numbers(s, "vt", m->vt + 2 * i, 2);
    for (i = 0; pattern && i < 3 * m->nf; i++)
        if (clothi_obj_new_pattern_vt(m, last, corner, i, &n))
            clothi_obj_write_numbers(s, "vt", m->X + 2 * (size_t)i, 2);
    if (pattern) memset(last, 0, 2 * sizeof *last * (size_t)m->nv);
    for (n = 0, i = 0; i < 3 * m->nf; i++) {
        if (i % 3 == 0 && m->part && (i == 0 || m->part[i / 3] != m->part[i / 3 - 1])) {
            clothi_sink_string(s, "g part");
            clothi_sink_int(s, m->part[i / 3]);
            clothi_sink_char(s, '\n');
        }
        clothi_sink_string(s, i % 3 ? " " : "f ");
        clothi_sink_int(s, m->faces[i] + 1);
        if (pattern) (void)clothi_obj_new_pattern_vt(m, last, corner, i, &n);
        if (pattern || m->nr > 0) {
            clothi_sink_char(s, '/');
            clothi_sink_int(s, pattern ? last[m->faces[i]] : m->render_faces[i] + 1);
        }
        if (i % 3 == 2) clothi_sink_char(s, '\n');
    }
}

/* Finite numbers, indices in range: a mesh that the caller wrote into may have neither. */
static cloth_status clothi_obj_check_mesh(const cloth_hooks *hooks, const cloth_mesh *m) {
    cloth_status status = clothi_check_counts(hooks, m->nv, m->nf);
    int          i;
    if (status != CLOTH_OK) return status;
    if (m->nr < 0 || m->nr > 3 * CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "nr = %i is out of range", m->nr);
    if ((m->nv > 0 && !m->x) || (m->nf > 0 && !m->faces) ||
        (m->nr > 0 && (!m->vt || !m->render_faces)))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_format: the mesh lacks an array");
    for (i = 0; i < 3 * m->nf; i++) {
        if (m->faces[i] < 0 || m->faces[i] >= m->nv)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "faces[%i] corner %i = %i but nv = %i",
                               i / 3, i % 3, m->faces[i], m->nv);
        if (m->nr > 0 && (m->render_faces[i] < 0 || m->render_faces[i] >= m->nr))
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "render_faces[%i] corner %i = %i but nr "
                               "= %i", i / 3, i % 3, m->render_faces[i], m->nr);
    }
    if (clothi_find_nonfinite(m->x, 3 * (size_t)m->nv) >= 0 ||
        (m->nr > 0 && clothi_find_nonfinite(m->vt, 2 * (size_t)m->nr) >= 0) ||
        (m->X && clothi_find_nonfinite(m->X, 6 * (size_t)m->nf) >= 0))
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "cloth_obj_format: a number of the mesh is "
                           "NaN or infinite: OBJ cannot hold it");
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_obj_format(const cloth_hooks *hooks, const cloth_mesh *mesh,
                                        char *buf, size_t capacity, size_t *needed) {
    clothi_sink  sink;
    cloth_status status;
    int         *last = NULL;
    if (!mesh) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_format: mesh is NULL");
    status = clothi_obj_check_mesh(hooks, mesh);
    if (status != CLOTH_OK) return status;
    if (mesh->nr == 0 && mesh->X) {
        last = (int *)clothi_alloc(hooks, 2 * (size_t)mesh->nv, sizeof(int));
        if (!last)
            return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to write %i vertices",
                               mesh->nv);
    }
    sink.buf = buf;
    sink.capacity = buf ? capacity : 0;
    sink.n = 0;
    clothi_obj_write(mesh, last, &sink);
    clothi_free(hooks, last);
    if (needed) *needed = sink.n;
    if (!buf || sink.n <= capacity) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "the OBJ text has %z bytes but capacity = %z",
                       sink.n, capacity);
}

/* --- files --- */

#ifdef CLOTH_NO_STDIO

CLOTH_API cloth_status cloth_obj_load(const cloth_hooks *hooks, const char *path,
                                      const cloth_obj_options *options, cloth_mesh **out) {
    (void)options;
    if (out) *out = NULL;
    return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "%s: built with CLOTH_NO_STDIO", path);
}

CLOTH_API cloth_status cloth_obj_save(const cloth_hooks *hooks, const char *path,
                                      const cloth_mesh *mesh) {
    (void)mesh;
    return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "%s: built with CLOTH_NO_STDIO", path);
}

#else

/* The whole of a file, owned by the caller; pipes too, so its size is found by reading. */
static cloth_status clothi_read_file(const cloth_hooks *hooks, const char *path, char **out,
                                     size_t *size) {
    FILE        *file = fopen(path, "rb");
    char        *buf = NULL;
    size_t       n = 0, capacity = 0;
    cloth_status status = CLOTH_OK;
    *out = NULL;
    if (!file) return clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be opened", path);
    do {
        if (n == capacity) {
            char *larger = (char *)clothi_alloc(hooks, capacity ? 2 * capacity : 65536u, 1);
            if (!larger) {
                status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "%s: no memory for %z bytes", path,
                                     2 * capacity);
                goto done;
            }
            if (n) memcpy(larger, buf, n);
            clothi_free(hooks, buf);
            buf = larger;
            capacity = capacity ? 2 * capacity : 65536u;
        }
        n += fread(buf + n, 1, capacity - n, file);
    } while (n == capacity);
    if (ferror(file)) {
        status = clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be read", path);
        goto done;
    }
    *out = buf;
    *size = n;
    buf = NULL;
done:
    clothi_free(hooks, buf);
    fclose(file);
    return status;
}

CLOTH_API cloth_status cloth_obj_load(const cloth_hooks *hooks, const char *path,
                                      const cloth_obj_options *options, cloth_mesh **out) {
    char        *text = NULL;
    size_t       size = 0;
    cloth_status status;
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_load: out is NULL");
    *out = NULL;
    if (!path) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_load: path is NULL");
    status = clothi_read_file(hooks, path, &text, &size);
    if (status == CLOTH_OK) status = cloth_obj_parse(hooks, text, size, options, out);
    clothi_free(hooks, text);
    return status;
}

CLOTH_API cloth_status cloth_obj_save(const cloth_hooks *hooks, const char *path,
                                      const cloth_mesh *mesh) {
    FILE        *file = NULL;
    char        *text = NULL;
    size_t       size = 0;
    cloth_status status;
    if (!path) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_obj_save: path is NULL");
    status = cloth_obj_format(hooks, mesh, NULL, 0, &size);
    if (status != CLOTH_OK) return status;
    text = (char *)clothi_alloc(hooks, size, 1);
    if (!text) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "%s: no memory for %z bytes", path,
                                  size);
    status = cloth_obj_format(hooks, mesh, text, size, NULL);
    if (status != CLOTH_OK) goto done;
    file = fopen(path, "wb");
    if (!file) {
        status = clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be opened for writing", path);
        goto done;
    }
    if (fwrite(text, 1, size, file) != size) status = CLOTH_ERR_IO;
    if (fclose(file) != 0) status = CLOTH_ERR_IO;
    if (status != CLOTH_OK) clothi_fail(hooks, status, "%s: cannot be written", path);
done:
    clothi_free(hooks, text);
    return status;
}

#endif

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
