/* clothsim.h - finite-element cloth for C programs, in one header.             version 0.2.0
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
 *     [2.1] VERSION AND LINKAGE              [2.2] STATUS AND HOOKS
 *     [2.3] TYPES                            [2.4] EVERYDAY (tier 1)
 *     [2.5] CONTROL (tier 2)                 [2.6] BUILDING BLOCKS (tier 3)
 *   the implementation, bottom-up: each section is a lesson
 *     [3.1] SMALL MATHS                      [3.2] MEMORY, TEXT, RANGES
 *     [4.1] MESH CHECK                       [4.2] TOPOLOGY
 *     [4.3] GENERATORS                       [4.4] REST SHAPE
 *     [4.5] OBJ FILES                        [4.6] CLOSED MESHES, WELD, ORIENT
 *     [5.1] MATERIALS
 *     [6.1] LANES, SPRING                    [6.2] STVK TRIANGLE
 *     [6.3] HINGE                            [6.4] QUADRATIC BENDING
 *     [6.5] STRETCH AND BENDING IN ONE
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

/* ===== [1.1] QUICK START =====================================================================
 *
 * A sheet, pinned at two corners, falls and swings for a second (examples/01_hang.c).
 *
 * ---- 01_hang.c ----
 *     #define CLOTHSIM_IMPLEMENTATION
 *     #include "clothsim.h"
 *     #include <stdio.h>
 *
 *     int main(void) {
 *         cloth_mesh  *sheet = NULL;
 *         cloth_model *model = NULL;
 *         cloth_sim   *sim = NULL;
 *         cloth_pin    pins[2] = {{0, CLOTH_AXIS_ALL}, {19, CLOTH_AXIS_ALL}};  // two corners
 *         cloth_desc   desc = cloth_desc_default();                           // always start here
 *         int          frame;
 *
 *         if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 20, 20, 1.0, 1.0, &sheet)) return 1;
 *         cloth_desc_set_mesh(&desc, sheet);
 *         desc.hooks.log.fn = cloth_log_stderr;                               // says what is wrong
 *         desc.npins = 2, desc.pins = pins;
 *         if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
 *         for (frame = 0; frame < 60; frame++)
 *             if (cloth_step(sim, 1.0 / 60, NULL)) return 1;                  // seconds
 *         printf("after %.3f s the far corner is at y = %.2f m\n", cloth_sim_state(sim)->t,
 *                cloth_sim_state(sim)->x[3 * 399 + 1]);
 *         cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, sheet);
 *         return 0;
 *     }
 * ---- end ----
 */

/* ===== [1.2] WHAT IT DOES NOT DO =============================================================
 *
 * No remeshing, tearing, fluids, GPU code, file formats beyond OBJ, no renderer. This header
 * knows no collisions: clothsim_collide.h does. Before you rely on a result, know that
 *   - StVK softens under compression: below a stretch of 1/sqrt(3) = 0.577 a triangle may
 *     collapse. report.collapsed counts such triangles, every step.
 *   - hinge bending depends on the mesh pattern. It is a plate of rigidity D only on equilateral
 *     triangles (any direction) or along a mesh axis; a one-diagonal grid is up to 3 times too
 *     stiff at 45 degrees, and refinement does not help. Its Poisson's ratio in bending is -1/3
 *     whatever the material says (examples/09_mesh_bias.c).
 *   - implicit Euler damps: a mode omega loses (h omega)^2 of its energy a step. Converging the
 *     step does not change that. CLOTH_INTEGRATOR_BDF2 or a smaller h does; 08_dt_order.c.
 *   - sheets that buckle diverge chaotically: two correct runs agree before buckling, and in
 *     statistics after it.
 */

/* ===== [1.3] CONVENTIONS =====================================================================
 *
 * Units are SI: metres, kilograms, seconds, newtons, joules, radians. A shirt is 1 m, not 100.
 * Arrays are row-major and dense; [nv x 3] is x y z of vertex 0, then of vertex 1. Doubles.
 *
 *   paper  code      meaning                        unit      shape
 *   x      x         position                       m         [nv x 3]
 *   v      v         velocity                       m/s       [nv x 3]
 *   X      X         flat rest corners              m         [nf x 3 x 2]
 *   m      mass      lumped vertex masses           kg        [nv]
 *   h      h         time step                      s
 *   F      F         deformation gradient dx/dX     1         [3 x 2]
 *   E      E         Green strain 1/2 (F'F - I)     1         [2 x 2]
 *   S      S         second Piola-Kirchhoff stress  N/m       [2 x 2]
 *   mu lambda        Lame constants of the sheet    N/m       Pa times thickness
 *   D      bending   plate rigidity                 N m
 *   c      c         hinge coefficient              N m       D |e|^2/(A1 + A2)
 *   theta  theta     hinge angle, convex positive   rad
 *   rho    density   mass per area                  kg/m^2
 *   eta    eta       step of the inertia term       s
 *
 * Faces turn counter-clockwise seen from the side that their normals point to; y is up where it
 * matters (gravity's default). Stiffness of a sheet is per metre of width: N/m, not Pa.
 *
 * Ownership, three words. copied: read during the call, yours again after it (arrays of a desc).
 * borrowed: a pointer into our object, with the call it lives until. owned: you destroy it.
 * _destroy(NULL) is allowed; create writes *out = NULL first; on failure nothing leaks.
 *
 * Errors. A cloth_status says how the call went, report.outcome how the numbers did. A refusal
 * names field and value through the log hook. No call prints, exits or aborts; errno is libc's.
 *
 * Threads. A model is constant and may be shared. A sim belongs to one thread at a time; its
 * step uses the parallel hook if there is one. No global or static variable is ever written.
 *
 * Determinism. Same inputs: the same bits, for any worker count and scheduling, and with
 * -ffp-contract=off on every platform of tests/platforms.sh. Not across AVX2 or our versions.
 */

/* ===== [1.4] CONFIGURATION ===================================================================
 *
 * @@ CLOTHSIM_IMPLEMENTATION   one .c file: compile the implementation here
 * @@ CLOTHSIM_STATIC           all files: every function static, private to the file
 * @@ CLOTH_API                 all files: linkage of public functions, e.g. dllexport
 * @@ CLOTH_MALLOC CLOTH_FREE   implementation: instead of <stdlib.h>; both or none. The allocator
 *                              hook is the better way
 * @@ CLOTH_NO_STDIO            implementation: no file wrappers; they return _UNSUPPORTED
 * @@ CLOTH_NO_SIMD             implementation: plain C loops only, no intrinsics
 * @@ CLOTH_ALLOW_FAST_MATH     all files: do not refuse -ffast-math and its like, by #error or at
 *                              create (results lose meaning)
 * None changes a struct's layout or a function's signature.
 */

/* ===== [1.5] REFERENCES ======================================================================
 *
 * [BB08]   Bonet, Wood: Nonlinear Continuum Mechanics for Finite Element Analysis, 2008. [6.2]
 * [BMF03]  Bridson, Marino, Fedkiw: Simulation of Clothing with Folds and Wrinkles, SCA 2003.
 *          The hinge's weight |e|^2/(|n1|+|n2|). [6.3]
 * [BW98]   Baraff, Witkin: Large Steps in Cloth Simulation, SIGGRAPH 1998. [9.3]
 * [BWH06]  Bergou, Wardetzky, Harmon, Zorin, Grinspun: A Quadratic Bending Model for
 *          Inextensible Surfaces, SGP 2006. [6.4]
 * [D06]    Davis: Direct Methods for Sparse Linear Systems, SIAM 2006. [7.4]
 * [DR83]   Duff, Reid: The Multifrontal Solution of Indefinite Sparse Symmetric Linear Equations,
 *          ACM Trans. Math. Softw. 9, 1983. [7.4]
 * [DRAPE22] a public list of 618 fabrics with linear bending coefficients, 2022. [5.1]
 * [E81]    Eisenstat: Efficient Implementation of a Class of Preconditioned Conjugate Gradient
 *          Methods, SIAM J. Sci. Stat. Comput. 2, 1981. [7.3]
 * [GHDS03] Grinspun, Hirani, Desbrun, Schroeder: Discrete Shells, SCA 2003. [6.3]
 * [HLW06]  Hairer, Lubich, Wanner: Geometric Numerical Integration, 2nd ed. 2006. [9.4]
 * [HS52]   Hestenes, Stiefel: Methods of Conjugate Gradients for Solving Linear Systems, 1952.
 * [L21]    Li et al.: Deep Physics-aware Inference of Cloth Deformation for Monocular Human
 *          Performance Capture, 3DV 2021. Its parameters: cloth_material_li2021(). [5.1]
 * [MLG17]  Magisano, Leonetti, Garcea: How to Improve Efficiency and Robustness of the Newton
 *          Method in Geometrically Non-linear Structural Problem Discretized via Displacement-based
 *          Finite Elements, Comput. Methods Appl. Mech. Eng. 313, 2017. [9.2]
 * [N87]    Nicolaides: Deflation of Conjugate Gradients with Applications to Boundary Value
 *          Problems, SIAM J. Numer. Anal. 24, 1987. [7.3]
 * [NW06]   Nocedal, Wright: Numerical Optimization, 2nd ed. 2006. [9.2]
 * [S83]    Steihaug: The Conjugate Gradient Method and Trust Regions in Large Scale Optimization,
 *          SIAM J. Numer. Anal. 20, 1983. [7.3]
 * [SW90]   Steele, White: How to Print Floating-Point Numbers Accurately, PLDI 1990. [4.5]
 * [TG13]   Tamstorf, Grinspun: Discrete Bending Forces and Their Jacobians, Graph. Models 2013.
 *          [6.3]
 * [WOR11]  Wang, O'Brien, Ramamoorthi: Data-Driven Elastic Models for Cloth, SIGGRAPH 2011. [5.1]
 */

#ifndef CLOTHSIM_H
#define CLOTHSIM_H

#include <stddef.h>
#include <stdint.h>

/* ===== [2.1] VERSION AND LINKAGE ============================================================= */

#define CLOTH_VERSION_MAJOR 0
#define CLOTH_VERSION_MINOR 2
#define CLOTH_VERSION_PATCH 0
#define CLOTH_VERSION_NUM \
    (10000 * CLOTH_VERSION_MAJOR + 100 * CLOTH_VERSION_MINOR + CLOTH_VERSION_PATCH)

#if (defined(__FAST_MATH__) || defined(_M_FP_FAST)) && !defined(CLOTH_ALLOW_FAST_MATH)
#error "clothsim.h needs IEEE arithmetic: compile this file without -ffast-math or /fp:fast"
#endif

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
    X(CLOTH_ERR_ARGUMENT,    -1, "an argument is NULL or out of range; hooks.log names it")        \
    X(CLOTH_ERR_UNINIT,      -2, "the desc was not made by its _default() function")             \
    X(CLOTH_ERR_MEMORY,      -3, "the allocator returned NULL")                                  \
    X(CLOTH_ERR_CAPACITY,    -4, "a fixed capacity is too small")                                \
    X(CLOTH_ERR_MESH,        -5, "the mesh is bad, or cloth and obstacle intersect: part them")   \
    X(CLOTH_ERR_PARSE,       -6, "the text is not a readable OBJ file")                          \
    X(CLOTH_ERR_IO,          -7, "a file could not be opened, read or written")                  \
    X(CLOTH_ERR_UNSUPPORTED, -8, "not built in, or not asked for: contact needs desc.contact")     \
    X(CLOTH_ERR_NONFINITE,   -9, "a number is NaN or infinite")                                  \
    X(CLOTH_ERR_STEP,       -10, "no step; state as before: a shorter h? statics: pinned?")        \
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

/* A ready log.fn: "error: text (status)" on stderr; silent where CLOTH_NO_STDIO is defined. */
CLOTH_API void cloth_log_stderr(cloth_log_level level, cloth_status status, const char *text,
                                void *user);

/* A range of a loop: items [begin, end); worker in [0, max_workers) selects scratch only. */
typedef void cloth_range_fn(int begin, int end, int worker, void *ctx);

/* run() calls fn on disjoint ranges that cover [0, count), of any order and size, and returns when
 * all are done; threads that step sims of one model call it at once. No result depends on it. */
typedef struct cloth_parallel {             /* run == NULL: serial                             */
    void (*run)(void *user, int count, int grain, cloth_range_fn *fn, void *ctx);
    void  *user;
    int    max_workers;
} cloth_parallel;

typedef struct cloth_clock {                /* fn == NULL: every time in a report is 0         */
    double (*fn)(void *user);               /* s, from any origin                              */
    void    *user;
} cloth_clock;

/* Asked in each Newton iteration, every 16 substeps of LEAPFROG, each pass of impact zones and each
 * iteration of a QP (in a zone: over 200 rows; workers ask nobody). 0: go on. 1: give the step up,
 * the state is as before, CLOTH_ERR_CANCELLED. 2, while the answer stays 2: the host's time is up;
 * the Newton iteration under way is the last of its substep, and where it leads is accepted,
 * CLOTH_OK with CLOTH_STEP_MAX_ITERATIONS, be it with more energy than the step began with; what
 * has no early end (LEAPFROG, zones, QP) goes on. */
typedef struct cloth_cancel {
    int  (*fn)(void *user);
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
    const char *names;      /* npart texts, each ended by 0: what OBJ calls the parts, or NULL */
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

/* --- linear algebra --- */

typedef struct cloth_pattern       cloth_pattern;        /* which blocks a matrix has          */
typedef struct cloth_matrix        cloth_matrix;         /* symmetric, 3x3 blocks              */
typedef struct cloth_linear_solver cloth_linear_solver;  /* scratch and factors of A x = b     */

typedef enum cloth_linear {
    CLOTH_LINEAR_AUTO     = 0,      /* SGS; where a factor pays, CHOLESKY (default)            */
    CLOTH_LINEAR_JACOBI   = 1,      /* CG, blocks of the diagonal; doubles: the textbook       */
    CLOTH_LINEAR_SGS      = 2,      /* CG, symmetric Gauss-Seidel with a coarse space          */
    CLOTH_LINEAR_CHOLESKY = 3,      /* a sparse factor                                         */
    CLOTH_LINEAR_FORCE_INT = 0x7fffffff
} cloth_linear;

typedef struct cloth_linear_options {
    cloth_linear         method;            /* default AUTO                                    */
    double               tolerance;         /* the residual's, relative; default 0.05; 0: 1e-30*/
    double               radius;            /* m, trust radius on max |x|; default 0: none     */
    int                  max_iterations;    /* default 0: 20000                                */
    const unsigned char *fixed;             /* [nv] bits 1 2 4: x y z are 0; NULL: none        */
} cloth_linear_options;

typedef struct cloth_linear_report {
    int    iterations;
    int    negative;                        /* met a direction of no positive curvature        */
    int    hit;                             /* x ends at the radius                            */
    int    factorizations;
    double residual;                        /* relative, in the norm of the preconditioner;
                                               with hit, before the move to the radius         */
    double decrease;                        /* J, b.x - x.A x / 2 of the answer                */
} cloth_linear_report;

/* --- the ladder: a scene takes the lowest rung that meets its tolerance --- */
typedef enum cloth_membrane {
    CLOTH_MEMBRANE_SPRINGS = 1,             /* a spring on each edge                           */
    CLOTH_MEMBRANE_STVK    = 2              /* constant strain triangles (default)             */
} cloth_membrane;

typedef enum cloth_bend_model {
    CLOTH_BEND_NONE      = 1,               /* no hinge array at all                           */
    CLOTH_BEND_QUADRATIC = 2,               /* flat rest shape, constant Hessian               */
    CLOTH_BEND_HINGE     = 3,               /* dihedral angles (default)                       */
    CLOTH_BEND_SHELL     = 4                /* not built: refused by name                      */
} cloth_bend_model;

typedef enum cloth_integrator {
    CLOTH_INTEGRATOR_LEAPFROG = 1,          /* explicit, order 2, no matrix                    */
    CLOTH_INTEGRATOR_EULER    = 2,          /* implicit, order 1, damps (default)              */
    CLOTH_INTEGRATOR_BDF2     = 3           /* implicit, order 2; by Euler at a new h, after a
                                               write or impact, for energy from nowhere [9.3]  */
} cloth_integrator;

typedef enum cloth_contact_rung {
    CLOTH_CONTACT_NONE      = 1,            /* (default) 0 bytes, 0 calls                      */
    CLOTH_CONTACT_OBSTACLES = 2,            /* clothsim_collide.h                              */
    CLOTH_CONTACT_SELF      = 3             /* clothsim_collide.h                              */
} cloth_contact_rung;

typedef enum cloth_rest_angle {
    CLOTH_REST_ANGLE_TEMPLATE = 1,          /* rest angles of x_rest                           */
    CLOTH_REST_ANGLE_FLAT     = 2           /* zero                                            */
} cloth_rest_angle;

enum { CLOTH_AXIS_X = 1, CLOTH_AXIS_Y = 2, CLOTH_AXIS_Z = 4, CLOTH_AXIS_ALL = 7 };

typedef struct cloth_pin {                  /* a vertex (or some of its axes) on a target      */
    int      vertex;
    unsigned axes;                          /* CLOTH_AXIS_... or'ed                            */
} cloth_pin;

/* The follower shares the leader's coordinate on the given axes: a row of a strip that bends as
 * one. The offset at create is kept: x_follower = x_leader + (x0_follower - x0_leader). */
typedef struct cloth_tie {
    int      leader, follower;
    unsigned axes;
} cloth_tie;

typedef struct cloth_model cloth_model;     /* constant after create; shared by threads        */
typedef struct cloth_sim   cloth_sim;       /* one per thread                                  */

#define CLOTH_DEFAULT_AIR_DENSITY  1.2          /* kg/m^3, 20 C at sea level           */
#define CLOTH_DEFAULT_DRAG         1.0
#define CLOTH_DEFAULT_LIFT         0.05         /* of the drag along a face      */
#define CLOTH_DEFAULT_ATTACHMENTS  64
#define CLOTH_DEFAULT_TOLERANCE    1e-4         /* m                                   */
#define CLOTH_DEFAULT_CG_TOLERANCE 0.025
#define CLOTH_DEFAULT_SLEEP        1            /* s                                   */

/* Everything that a model is made from. Start from cloth_desc_default(). Arrays are copied. */
typedef struct cloth_desc {
    uint32_t    cookie;                     /* set by cloth_desc_default()                     */
    cloth_hooks hooks;                      /* copied                                          */

    /* the mesh: one or several cloths */
    int           nv;                       /* vertices                                        */
    const double *x_rest;                   /* [nv x 3] m, the template                        */
    int           nf;                       /* triangles                                       */
    const int    *faces;                    /* [nf x 3] counter-clockwise seen from outside    */
    const int    *part;                     /* [nf] which cloth, 0 .. nf-1; NULL: all 0        */
    const int    *region;                   /* [nf] which material, NULL: all 0                */
    const double *X;                        /* [nf x 3 x 2] m, flat corners; NULL: flatten     */
    const double *x;                        /* [nv x 3] m, start; NULL: x_rest                 */
    const double *v;                        /* [nv x 3] m/s, start; NULL: 0                    */
    const double *vertex_mass;              /* [nv] kg; NULL: a third of each triangle         */
    cloth_rest_angle rest_angle;            /* default TEMPLATE                                */

    /* what it is made of */
    int                   nregions;         /* 0: `material` everywhere                        */
    const cloth_material *materials;        /* [nregions]                                      */
    cloth_material        material;         /* when nregions == 0                              */

    /* the ladder */
    cloth_membrane     membrane;
    cloth_bend_model   bend;
    cloth_integrator   integrator;
    cloth_contact_rung contact;
    int                substeps;            /* of a step; 0: 1, or what contact asks for; or
                                               LEAPFROG's stability limit, beyond which fewer
                                               are refused                                     */
    int                max_newton;          /* per substep; 0: to `tolerance`; more where it
                                               would bring energy from nowhere                 */

    /* the world */
    double gravity[3];                      /* m/s^2, default 0 -9.81 0                        */
    int    wind_on;                         /* 0 (default): the term is not walked             */
    double wind[3];                         /* m/s, velocity of the air                        */
    double air_density;                     /* kg/m^3, default 1.2                             */
    double drag, lift;                      /* across and along a face, 1.0 and 0.05; >= 0     */

    /* what holds it */
    int              npins;                 /* pinned at their start position                  */
    const cloth_pin *pins;                  /* [npins]                                         */
    int              nties;
    const cloth_tie *ties;                  /* [nties]; a follower has one leader an axis      */
    int              max_attachments;       /* capacity, default 64                            */

    /* how it is solved */
    double       tolerance;                 /* m, largest last Newton update; default 1e-4     */
    double       cg_tolerance;              /* of a linear solve, relative; default 0.025; twice
                                               it with contact, but for fine tolerances [9.2]  */
    cloth_linear linear;                    /* default CLOTH_LINEAR_AUTO                       */
    double       sleep;                     /* s at rest till it sleeps; 0: never; cloth_step() */
} cloth_desc;

/* What a fit changes without a new analysis. Owned by the sim: write, then call
 * cloth_sim_params_changed(). Counts are constant. */
typedef struct cloth_params {
    int             nregions, nh, nf, nv;
    cloth_material *material;               /* [nregions]                                      */
    double         *hinge_scale;            /* [nh] factor on c, default 1                     */
    double         *theta0;                 /* [nh] rad, rest angles; whole turns do not count */
    double         *X;                      /* [nf x 3 x 2] m, flat rest corners               */
    double         *mass;                   /* [nv] kg                                         */
    int             mass_given;             /* 0: mass is lumped anew from density and X       */
} cloth_params;

typedef struct cloth_state {
    double *x;                              /* [nv x 3] m    position                          */
    double *v;                              /* [nv x 3] m/s  velocity                          */
    double  t;                              /* s             simulated time                    */
} cloth_state;

typedef enum cloth_outcome {
    CLOTH_STEP_NONE             = 0,        /* nothing was accepted                            */
    CLOTH_STEP_CONVERGED        = 1,
    CLOTH_STEP_MAX_ITERATIONS   = 2,        /* the desc's cap; accepted                        */
    CLOTH_STEP_STALLED          = 3,        /* no decrease found; LEAPFROG: not stable         */
    CLOTH_STEP_COLLISION_FAILED = 4,
    CLOTH_STEP_ASLEEP           = 5         /* time passed, see cloth_step()                   */
} cloth_outcome;

/* Energies in J. The balance of a step: kinetic + potential (stretch, bend, gravity, attach,
 * other) changes by the work of wind, forces, pins and contact, less the four losses. What contact
 * books: clothsim_collide.h [8.5]; 0 without it. */
typedef struct cloth_ledger {
    double kinetic, stretch, bend, gravity, attach, other;      /* at the end of the step      */
    double wind_work, force_work, pin_work;                     /* done on the cloth in it     */
    double contact_work;                    /* the same by E_col, obstacles that move, pinches */
    double damping_loss;                                        /* material damping            */
    double friction_loss;                   /* of contact: friction's force times the slip     */
    double zone_loss;                       /* of contact: speed that the impact zones take,
                                               less the strain that their push brings in       */
    double numerical_loss;                                      /* what balances the rest      */
    double total;                                               /* kinetic + potential         */
    double contact;                         /* held by E_col at the end; no part of the total  */
} cloth_ledger;

typedef struct cloth_times {                /* ms, 0 without a clock hook; each moment once     */
    double total, assemble, linear, line_search, contact, other;
} cloth_times;

typedef struct cloth_counts {               /* of this step                                    */
    long long triangles, springs, hinges;   /* elements evaluated, in any pass                 */
    long long hessians;                     /* elements whose Hessian was evaluated            */
    long long bend_assemblies;              /* times that bending entered a matrix anew        */
    long long wind_faces;                   /* faces whose wind was evaluated                  */
    long long contact_calls;
    long long allocations;                  /* calls of the allocator                          */
} cloth_counts;

typedef struct cloth_bytes {                /* held by model and sim together                  */
    size_t mesh, elements, matrix, factor, state, scratch, contact, total;
} cloth_bytes;

typedef struct cloth_report {
    cloth_status  status;                   /* as returned                                     */
    cloth_outcome outcome;
    double h;                               /* s, the step asked for                           */
    int    substeps;                        /* taken                                           */
    int    newton;                          /* iterations, all substeps                        */
    int    cg;                              /* CG iterations                                   */
    int    linear_solves;
    int    factorizations;                  /* sparse Cholesky                                 */
    int    halvings;                        /* of the line search                              */
    int    projected;                       /* iterations with the semidefinite Hessian        */
    int    negative;                        /* linear solves that met negative curvature       */
    int    restarts;                        /* BDF2: substeps taken as implicit Euler          */
    double residual_m;                      /* m, largest last Newton update                   */
    double residual_N;                      /* N, largest force imbalance at the result, before
                                               impact zones                                    */
    double omega_max;                       /* rad/s, LEAPFROG's estimate                      */
    double min_stretch;                     /* smallest principal stretch                      */
    int    min_stretch_face;
    int    collapsed;                       /* triangles below 1/sqrt(3), where StVK softens   */
    int    folded;                          /* hinges beyond 3 rad                             */
    int    vertex;                          /* at fault (non-finite, stalled), or -1           */
    double momentum[3];                     /* kg m/s                                          */
    double angular[3];                      /* kg m^2/s, about the origin                      */
    cloth_ledger energy;
    cloth_times  ms;
    cloth_counts counts;
    cloth_bytes  bytes;
    /* filled by clothsim_collide.h */
    int    contacts;                        /* with a force or an impulse in the last substep  */
    int    exempt_pairs;
    int    failed_pairs;
    double smallest_gap;                    /* m, at the end, of what may push; at most its t  */
} cloth_report;

typedef struct cloth_attachment {           /* index + generation, 0 = none                    */
    uint64_t id;
} cloth_attachment;

/* Callbacks that draw; any may be NULL. Colours 0xRRGGBB; positions in m. */
typedef struct cloth_debug_draw {
    void (*line)(const double a[3], const double b[3], unsigned rgb, void *user);
    void (*triangle)(const double a[3], const double b[3], const double c[3], unsigned rgb,
                     void *user);
    void (*point)(const double a[3], double size_px, unsigned rgb, void *user);
    void (*text)(const double a[3], const char *text, unsigned rgb, void *user);
    void *user;
} cloth_debug_draw;

/* --- the record of a step --- */

/* A spring to a point p of a face. It pulls p, or of a stitch p less the point of the other face,
 * towards pose + s (target - pose), s from 0 at the start of the step to 1 at its end. */
typedef struct cloth_step_attachment {      /* all zero when not used                          */
    int32_t used, face;
    double  bary[3];
    double  k;                              /* N/m                                             */
    double  pose[3], target[3];             /* m, at the step's start and at its end           */
    int32_t on, other;                      /* 0 space, -1 cloth, else obstacle, its face      */
    double  at[3];                          /* barycentric, of the point there                 */
} cloth_step_attachment;

/* All that a substep reads beside model and params. Borrowed from the sim: as long as the call. */
typedef struct cloth_step_input {
    double h;                               /* s, of the substep; 0: statics, energies         */
    double t;                               /* s, at its start                                 */
    double share[2];                        /* of the way to goals and targets, at the substep's
                                               start and end; the step's: 0, and 1, or less of a
                                               shorter one of cloth_collide_step()             */
    const double *x, *v;                    /* [nv x 3] m, m/s: x^n, v^n                       */
    const double *x_prev, *v_prev;          /* [nv x 3] one substep before; NULL: no history   */
    double        h_prev;                   /* s, of the substep before (LEAPFROG goes by it)  */
    double        eta;                      /* s, of M (x - y)/eta^2 in the gradient; 0: none  */
    int           squeezed;                 /* contact found a way by less room for its barrier */
    const double *y;                        /* [nv x 3] m; NULL: statics, LEAPFROG             */
    const unsigned char *pin;               /* [nv] axes; those of a follower are its leader's */
    const double *goal;                     /* [nv x 3] m, of what is pinned, at share[1]; of
                                               LEAPFROG and of a whole step at the step's end  */
    double        gravity[3];               /* m/s^2                                           */
    const double *force;                    /* [nv x 3] N, external; NULL: none                */
    int           wind_on;
    double        wind[3];                  /* m/s                                             */
    int           nattach;                  /* slots; 0: none is used                          */
    const cloth_step_attachment *attach;    /* [nattach]                                       */
} cloth_step_input;

/* What an accepted step was made from and what came of it. state, packed: all that cloth_step_input
 * shows, and the states of hosts' terms and of contact (poses of obstacles at both ends, anchors,
 * holds); cloth_step_replay() shows it again. To keep a record copy its arrays. */
typedef struct cloth_step_record {
    uint64_t      model;                    /* cloth_model_hash()                              */
    double        h;                        /* s, of the whole step; 0: cloth_solve_static()   */
    const void   *state;                    /* [bytes]                                         */
    size_t        bytes;
    int           nv;
    const double *x, *v;                    /* [nv x 3] x^(n+1), v^(n+1)                       */
    cloth_outcome outcome;
    int           ncontact;                 /* pairs with a force at the end                   */
    const struct cloth_collide_contact *contact;        /* [ncontact], clothsim_collide.h      */
} cloth_step_record;

/* Is told what a sim does, either of two. All is borrowed for the call, which may not change it. */
typedef struct cloth_recorder {
    void *user;
    /* a substep ends at x [nv x 3]; in->share[0] is 0 when a step begins, or begins anew with more
     * substeps. LEAPFROG: at each kick, one more than substeps: x is in->x, in->v half one old */
    void (*substep)(void *user, const cloth_step_input *in, const double *x);
    void (*step)(void *user, const cloth_step_record *record);  /* one was accepted */
} cloth_recorder;

/* --- energy terms: the one extension point --- */

/* What a term sees. Read only, but for grad and hess, which are added to.
 * EULER and BDF2: the substep from x_n, v_n to t, of h. Statics and energies: h = 0, x_n and v_n
 * the state. LEAPFROG asks a host's term for the force at x, which it has at t: h = 0, x_n == x,
 * v_n the velocity half a substep ago (at the step's start: that of the state), hess NULL. */
typedef struct cloth_eval {
    const cloth_model  *model;
    const cloth_params *params;
    const cloth_step_input *in;             /* of the substep                                  */
    int           nv;
    double        h;                        /* s of the substep; 0: see above                  */
    double        t;                        /* s at x                                          */
    const double *x;                        /* [nv x 3] m, where to evaluate                   */
    const double *x_n;                      /* [nv x 3] m, start of the substep                */
    const double *v_n;                      /* [nv x 3] m/s                                    */
    double       *grad;                     /* [nv x 3] N, add dE/dx; NULL: not wanted         */
    cloth_matrix *hess;                     /* add d2E/dx2; NULL: not wanted                   */
    int           psd;                      /* nonzero: a positive semidefinite Hessian        */
} cloth_eval;

/* Where vjp adds a' d(grad)/d{...}. A NULL member is not wanted. */
typedef struct cloth_vjp {
    double *x_n, *v_n;                      /* [nv x 3]                                        */
    double *force;                          /* [nv x 3] external force                         */
    double *mass;                           /* [nv]                                            */
    double *gravity, *wind;                 /* [3]                                             */
    double *mu, *lambda, *bending, *damping;/* [nregions]                                      */
    double *theta0, *hinge_scale;           /* [nh]                                            */
    double *X;                              /* [nf x 3 x 2]                                    */
    double *attach;                         /* [max_attachments x 3] targets                   */
    double *attach_k;                       /* [max_attachments]                               */
    double *h;                              /* [1]                                             */
    double *x;                              /* [nv x 3] of contact: by e->x, alone             */
    int     frozen, own;                    /* out: of contact, something that moves was taken as
                                               constant; 1: add to the term's parameters too   */
    int     pass;                           /* rows_vjp: whose rows, made at e->x              */
} cloth_vjp;

typedef struct cloth_term {
    const char *name;
    void       *user;
    /* at the start of a substep, and at h = 0 before forces of LEAPFROG and energies are asked
     * for: lag what has no potential; may be NULL */
    cloth_status (*begin)(void *user, const cloth_eval *e);
    /* *energy = value at e->x in J; adds to e->grad and e->hess. Finite in, finite out */
    cloth_status (*eval)(void *user, const cloth_eval *e, double *energy);
    /* adds a' d(grad)/d{...}, a [nv x 3]; NULL: gradients of a sim with this term are refused */
    cloth_status (*vjp)(void *user, const cloth_eval *e, const double *a, cloth_vjp *out);
    /* bytes of the term's own state that the next step depends on; may be NULL. A step that
     * fails loads what was saved at its start */
    size_t (*save_size)(void *user);        /* may change from step to step                    */
    void   (*save)(void *user, void *buf);  /* every byte of it; buf is a multiple of 8 bytes
                                               behind the start of the snapshot                */
    void   (*load)(void *user, const void *buf);        /* as many bytes as were saved         */
    /* N/m, of LEAPFROG's stability limit: the largest sum of |d2E/dx2| along a row; 0: the cloth is
     * stiffer. A spring to a fixed point has its k, one between two vertices 2 k */
    double stiffness;
} cloth_term;

/* n . sum w x >= bound of an impact zone and, where multiplier > 0, n . sum w v >= speed; sums over
 * vertices of cloth, v < nv. What is of obstacles is in bound and speed. */
#define CLOTH_ROW_RATES 9
typedef struct cloth_contact_row {
    int    kind, a, b;                      /* the pair                                        */
    int    n, v[4];                         /* world vertices                                  */
    double w[4], normal[3];
    double bound, multiplier;               /* m, kg m: M (x - x*) = sum multiplier w n        */
    double speed, impulse;                  /* m/s, N s: its multiplier                        */
    double slack;                           /* m, of bound over what detection asks for        */
    double toi;                             /* of the way to where it was found                */
    int    zone, pass;                      /* pass: in which its frame was made               */
} cloth_contact_row;

struct cloth_obstacle;
enum { CLOTH_ADJOINT_BEGIN, CLOTH_ADJOINT_STEP, CLOTH_ADJOINT_END, CLOTH_ADJOINT_PASS,
       CLOTH_ADJOINT_FORGET };
typedef struct cloth_contact_grad {         /* as in cloth_grad                                */
    double *friction, *part_friction;       /* [1 + slots], [parts]                            */
    const double *attach;                   /* [max_attachments x 3] by targets of step k      */
    void  (*obstacle)(int k, struct cloth_obstacle id, const double *g, void *user), *user;
} cloth_contact_grad;

#define CLOTH_SUBSTEPS_ASKED 4              /* the most that contact asks for in a step        */

/* What clothsim_collide.h fills in. Without it nothing is called and nothing allocated. In a
 * substep:
 *   begin, start   what it has at x_n; the guess to a feasible point
 *   update, eval   in every Newton iterate, whose move is cut by max_step
 *   close          the minimiser is where the substep ends
 * and commit when the whole step is accepted, rollback when it is not. */
typedef struct cloth_contact {
    void *user;
    cloth_status (*begin)(void *user, const cloth_eval *e);
    /* x was accepted, residual [nv x 3] N (NULL: to begin with): renews what is lagged (frames), so
     * that eval changes. *done 1: it is a minimiser for the lagged normal forces; they are renewed,
     * and it is 0 where that matters */
    cloth_status (*update)(void *user, const double *x, const double *residual, int *done);
    cloth_status (*eval)(void *user, const cloth_eval *e, double *energy);
    /* *part: the largest one of dx, in (0, 1], on whose way nothing comes nearer than it may */
    cloth_status (*max_step)(void *user, const double *x, const double *dx, double *part);
    /* x [nv x 3]: in, where it would go; out, a feasible point to minimise from. *impact 1: nothing
     * may be extrapolated over this substep. other [nv x 3]: where the way there is free, one more
     * feasible point on it; returned as x otherwise. The better one is taken */
    cloth_status (*start)(void *user, const cloth_eval *e, double *x, double *other, int *impact);
    /* x is where the substep ends */
    cloth_status (*close)(void *user, const double *x, int *impact);
    /* LEAPFROG: from a candidate to a feasible x and v, [nv x 3] */
    cloth_status (*resolve)(void *user, const cloth_eval *e, double *x, double *v);
    void         (*commit)(void *user, cloth_report *report);
    void         (*rollback)(void *user, cloth_report *report); /* report: may be NULL         */
    void         (*reset)(void *user);      /* back to the start, with cloth_sim_reset         */
    size_t       (*save_size)(void *user);
    void         (*save)(void *user, void *buf);
    void         (*load)(void *user, const void *buf);
    cloth_status (*vjp)(void *user, const cloth_eval *e, const double *a, cloth_vjp *out);
    size_t       (*bytes)(void *user);
    /* before load, of the same bytes: makes room for them, or refuses them; NULL: not asked */
    cloth_status (*check)(void *user, const void *buf, size_t size);
    /* at the end of a substep, where a report is wanted: adds its work and losses to the ledger;
     * zone_loss: what comes from outside through the zones. NULL: not asked */
    void         (*balance)(void *user, cloth_ledger *ledger);
    /* the first max contacts with a force, of contact_size bytes each; returns how many there are.
     * NULL: not recorded */
    int          (*contacts)(void *user, int max, void *contact);
    size_t         contact_size;
    /* of the poses of the step that begins, or ends: 1: none may sleep. commit comes without begin
     * where it sleeps. NULL: not asked */
    int          (*moves)(void *user);
    /* EULER, BDF2, desc.substeps 0, desc.contact not NONE: how many the step that begins is to
     * have, of 1 to CLOTH_SUBSTEPS_ASKED. NULL: 1 */
    int          (*substeps)(void *user);
    /* another is set, or the sim is destroyed, its allocator with it: what was set before may only
     * be destroyed. NULL: not told */
    void         (*orphan)(void *user);
    /* around calls of vjp along a tape, from its end: BEGIN; STEP when all substeps of recorded
     * step k are done; END, k = 0, out NULL: results are not wanted; PASS: resolve ends where pass
     * k begins, 0: at its end; FORGET: as if x were written. NULL: gradients are refused */
    cloth_status (*adjoint)(void *user, int what, int k, const cloth_contact_grad *out);
    /* LEAPFROG, for gradients: the rows [*n] of the last resolve, with their multipliers; NULL:
     * gradients are refused. rows_vjp adds what rate [n x CLOTH_ROW_RATES] does: dL/d{normal [3], w
     * [4], bound, speed} of each row of out->pass, which began at e->x */
    const cloth_contact_row *(*rows)(void *user, int *n);
    void (*rows_vjp)(void *user, const cloth_eval *e, const double *rate, cloth_vjp *out);
    /* forwards, for checks, what vjp has: adds how grad moves with dx_n and dx (NULL: 0) and with
     * anchors to out [nv x 3]; out NULL: moves anchors on over the substep. NULL: no such check */
    cloth_status (*jvp)(void *user, const cloth_eval *e, const double *dx_n, const double *dx,
                        double *out);
} cloth_contact;

/* What cloth_advise() found: the groups that decide which rung a scene needs. */
typedef struct cloth_advice {
    double gravity_bending;                 /* rho g L^3 / D: large, bending hardly matters    */
    double step_bending;                    /* h omega of the stiffest bending mode            */
    double step_membrane;                   /* h omega of the stiffest membrane mode           */
    double self_reach;                      /* fastest travel a step over the mesh's edge      */
    double euler_loss;                      /* relative energy lost a step at the slowest mode */
    int    leapfrog_substeps;               /* that the stability limit asks for, estimated    */
    cloth_membrane     membrane;
    cloth_bend_model   bend;
    cloth_integrator   integrator;
    cloth_contact_rung contact;
    double             h;                   /* s, substep that meets the tolerance             */
} cloth_advice;
/* --- mesh: OBJ --- */

typedef enum cloth_obj_parts {
    CLOTH_OBJ_PARTS_NONE    = 0,    /* no part array                                           */
    CLOTH_OBJ_PARTS_OBJECTS = 1,    /* faces under one `o` name are a part                     */
    CLOTH_OBJ_PARTS_GROUPS  = 2,    /* faces under one `g` name are a part                     */
    CLOTH_OBJ_PARTS_MATERIALS = 3,  /* faces under one `usemtl` name are a part                */
    CLOTH_OBJ_PARTS_FORCE_INT = 0x7fffffff
} cloth_obj_parts;

typedef struct cloth_obj_options {
    uint32_t        cookie;         /* set by cloth_obj_options_default                        */
    double          scale;          /* m per unit of v, > 0; default 1                         */
    double          pattern_scale;  /* m per unit of vt: > 0: vt become the pattern X, and every
                                       corner must have one; default 0: X stays NULL           */
    cloth_obj_parts parts;          /* default CLOTH_OBJ_PARTS_NONE. Numbered in the order of
                                       their first faces; mesh->names in that order, "" before
                                       any name. A name ends where \ goes on, or at a byte 0   */
} cloth_obj_options;

/* ===== [2.4] EVERYDAY (tier 1) =============================================================== */

/* CLOTH_VERSION_NUM of the compiled implementation; compare with the macro of your header. */
CLOTH_API int cloth_version(void);

/* Every field set to its default; nothing to free. */
CLOTH_API cloth_desc cloth_desc_default(void);

/* The desc's mesh: nv, x_rest, nf, faces, X and part of mesh, borrowed until the model is made. */
CLOTH_API void cloth_desc_set_mesh(cloth_desc *desc, const cloth_mesh *mesh);

/* Makes a model: checks the desc, flattens, finds hinges, analyses the matrix.
 * in    desc   copied; every refusal names field and value through desc->hooks.log. Warned of
 *   there: wind without wind_on, faces that share no edge, cloth of over 400 m^2 or under 1 cm^2
 * out   *out   owned: cloth_model_destroy; NULL on failure
 * returns CLOTH_OK; _UNINIT, _ARGUMENT, _NONFINITE, _MESH, _UNSUPPORTED, _MEMORY
 * contract: alloc model | cost O(n log n) | threads: any, on distinct out */
CLOTH_API cloth_status cloth_model_create(const cloth_desc *desc, cloth_model **out);
CLOTH_API void         cloth_model_destroy(cloth_model *model);             /* NULL allowed   */

/* Makes a sim at the model's start state. The model must outlive it.
 * returns CLOTH_OK, _ARGUMENT, _MEMORY; *out owned: cloth_sim_destroy */
CLOTH_API cloth_status cloth_sim_create(const cloth_model *model, cloth_sim **out);
CLOTH_API void         cloth_sim_destroy(cloth_sim *sim);                   /* NULL allowed   */

/* Advances the state by h seconds (finite, > 0). report may be NULL.
 *   status               outcome                        state
 *   CLOTH_OK             CLOTH_STEP_CONVERGED           new
 *   CLOTH_OK             CLOTH_STEP_MAX_ITERATIONS      new (the desc's max_newton)
 *   CLOTH_OK             CLOTH_STEP_ASLEEP              as before but for t (desc.sleep)
 *   CLOTH_ERR_STEP       CLOTH_STEP_STALLED             as before (no decrease found; LEAPFROG:
 *       desc.substeps too few for its stability limit, or more than 1000000 substeps needed; BDF2:
 *       energy from nowhere, by implicit Euler too, whose search was cut short)
 *   CLOTH_ERR_STEP       CLOTH_STEP_COLLISION_FAILED    as before
 *   CLOTH_ERR_NONFINITE  CLOTH_STEP_NONE                as before; report.vertex
 *   CLOTH_ERR_MEMORY, CLOTH_ERR_CANCELLED   ..._NONE    as before
 *   CLOTH_ERR_ARGUMENT   CLOTH_STEP_NONE                as before (h)
 *   CLOTH_ERR_UNSUPPORTED   CLOTH_STEP_NONE             as before (desc.contact without contact)
 * "As before" means the same cloth_sim_hash().
 *
 * Sleep, if desc.sleep > 0. A sim is at rest from t0 on while, as steps end, no vertex is farther
 * than 4 desc.tolerance from where it was at t0, anew where one is. desc.sleep seconds on v becomes
 * 0 and steps move t alone, till a setter brings another value, a term or contact is added, a host
 * writes x or v, or an obstacle moves near the cloth. Wind, a conveyor or a host's term does not
 * wake of itself: who has a term that goes by t calls _state_changed(). What creeps slower than 4
 * tolerance/sleep sleeps; a pendulum that turns does not. A sim sleeps as a whole.
 * contract: alloc none after the first call, but by contacts that grow | threads: one per sim */
CLOTH_API cloth_status cloth_step(cloth_sim *sim, double h, cloth_report *report);

/* Equilibrium: moves x to a stationary point of the potential that has no direction of negative
 * curvature, zeroes v, keeps t. Same table. */
CLOTH_API cloth_status cloth_solve_static(cloth_sim *sim, cloth_report *report);

/* x, v, t: read and write directly; borrowed until cloth_sim_destroy. */
CLOTH_API cloth_state *cloth_sim_state(cloth_sim *sim);
/* After writing to the state: drops history, wakes. */
CLOTH_API void         cloth_sim_state_changed(cloth_sim *sim);
/* x and the faces as OBJ (cloth_obj_save [2.6]). */
CLOTH_API cloth_status cloth_sim_save_obj(const cloth_sim *sim, const char *path);
/* Back to the model's start: state, pins, attachments, forces, gravity, wind, materials; obstacles
 * to where, and as, they were added. What they intersect is looked at by the next step. */
CLOTH_API cloth_status cloth_sim_reset(cloth_sim *sim);

/* ===== [2.5] CONTROL (tier 2) ================================================================ */

/* --- run-time control: between steps; no allocation after first use, no new analysis --- */

/* Pins axes (CLOTH_AXIS_...) of a vertex; target [3] m (only the named axes are read; NULL: where
 * it is) is reached at the end of the next step and held after it. */
CLOTH_API cloth_status cloth_sim_pin(cloth_sim *sim, int vertex, unsigned axes,
                                     const double target[3]);
/* All axes. Where a vertex follows another by a tie, pin and unpin act on its leader. */
CLOTH_API cloth_status cloth_sim_unpin(cloth_sim *sim, int vertex);
/* A spring of stiffness k (N/m) from a point of a face (bary sums to 1) to target (m).
 * _CAPACITY when desc.max_attachments are in use. */
CLOTH_API cloth_status cloth_sim_attach(cloth_sim *sim, int face, const double bary[3], double k,
                                        const double target[3], cloth_attachment *id);
/* The same to a point `at` of another face, both ends pulled alike: E = 1/2 k |p - p_other|^2. It
 * closes over the next step. To a face of an obstacle: cloth_collide_attach(). */
CLOTH_API cloth_status cloth_sim_stitch(cloth_sim *sim, int face, const double bary[3], double k,
                                        int other, const double at[3], cloth_attachment *id);
/* Of a stitch target is p - p_other. An obstacle carries it no more. */
CLOTH_API cloth_status cloth_sim_attach_move(cloth_sim *sim, cloth_attachment id,
                                             const double target[3]);
CLOTH_API cloth_status cloth_sim_detach(cloth_sim *sim, cloth_attachment id);
/* f [nv x 3] N, copied; NULL: none. Stays until changed. */
CLOTH_API cloth_status cloth_sim_set_force(cloth_sim *sim, const double *f);
CLOTH_API cloth_status cloth_sim_set_gravity(cloth_sim *sim, const double g[3]);
/* Velocity of the air, m/s; NULL switches the wind off. */
CLOTH_API cloth_status cloth_sim_set_wind(cloth_sim *sim, const double w[3]);
CLOTH_API cloth_status cloth_sim_set_material(cloth_sim *sim, int region, const cloth_material *m);
/* Borrowed, read and write: a copy, made at the first call, that steps do not see until _changed()
 * has checked it; that call derives what follows (lumped masses, if mass_given is 0) and drops
 * BDF2's history. Refused: steps go on with what was accepted last, what was written stays, until
 * set_material, reset, restore, cloth_grad_check or cloth_layer_loss writes it anew. Counts and
 * pointers are to stay. _params: NULL if sim is or memory is out. _changed: _ARGUMENT, _NONFINITE,
 * _MESH (a rest area that is not > 0), _UNSUPPORTED, with field and value logged. */
CLOTH_API cloth_params *cloth_sim_params(cloth_sim *sim);
CLOTH_API cloth_status  cloth_sim_params_changed(cloth_sim *sim);
/* A host's own term; copied; its name and its user must outlive the sim. */
CLOTH_API cloth_status cloth_sim_add_term(cloth_sim *sim, const cloth_term *term);
/* Called by clothsim_collide.h; NULL takes the contact away, for good. */
CLOTH_API cloth_status cloth_sim_set_contact(cloth_sim *sim, const cloth_contact *contact);

/* --- record: a step is a function of model, params and one record --- */

/* Copied; NULL: none any more. */
CLOTH_API cloth_status cloth_sim_set_recorder(cloth_sim *sim, const cloth_recorder *recorder);
/* Puts the record's input (model, h and state of it are read) in place of the sim's and takes its
 * step: the same bits, if params are as then. _FORMAT, and the sim as before: its model, hosts'
 * terms or obstacles are others. A step that fails leaves it at the record's input. */
CLOTH_API cloth_status cloth_step_replay(cloth_sim *sim, const cloth_step_record *record,
                                         cloth_report *report);

/* --- snapshot: everything that the next step depends on --- */
CLOTH_API size_t       cloth_sim_save_size(const cloth_sim *sim);           /* bytes          */
/* _CAPACITY: size is below cloth_sim_save_size(). */
CLOTH_API cloth_status cloth_sim_save(const cloth_sim *sim, void *buf, size_t size);
/* Of this model, and with the host's terms added in the order that they had at the save. Verified
 * first are size, magic, the model by its aspects (the sentence names the one that differs: mesh,
 * ties, contact rung, start ...), checksum, the terms' names, and whether a sim could have saved
 * such fields: _FORMAT and _MEMORY leave the sim as it was. Handles of attachments become those of
 * the snapshot. */
CLOTH_API cloth_status cloth_sim_restore(cloth_sim *sim, const void *buf, size_t size);
/* Of what save writes, but for the numbers that tell handles of attachments apart. 0: no memory
 * for the state of a host's term (nothing is allocated when there is none). */
CLOTH_API uint64_t     cloth_sim_hash(const cloth_sim *sim);
CLOTH_API uint64_t     cloth_model_hash(const cloth_model *model);

/* --- queries --- */

/* For hosts that draw. pos, nrm: float [3] every `stride` bytes (0: 12), either may be NULL;
 * normals area-weighted, unit; origin [3] (NULL: 0) is subtracted in double. */
CLOTH_API cloth_status cloth_sim_vertices_f32(const cloth_sim *sim, const double origin[3],
                                              float *pos, float *nrm, size_t stride);
/* First face that the ray o + t d, t >= 0, meets. Returns 1 and t, face, bary; else 0. */
CLOTH_API int cloth_sim_ray(const cloth_sim *sim, const double o[3], const double d[3],
                            double *t, int *face, double bary[3]);
CLOTH_API void cloth_debug_draw_state(const cloth_sim *sim, const cloth_debug_draw *draw);
/* Borrowed from the model. */
CLOTH_API const cloth_topology *cloth_model_topology(const cloth_model *model);
CLOTH_API const cloth_model    *cloth_sim_model(const cloth_sim *sim);
/* Blocks of the Hessian per vertex row, full symmetric count, averaged; 0 for LEAPFROG. */
CLOTH_API double cloth_model_blocks_per_row(const cloth_model *model);
/* Smallest and largest principal stretch of each face at the state; outputs [nf] may be NULL. */
CLOTH_API cloth_status cloth_sim_stretches(const cloth_sim *sim, double *smallest, double *largest);
/* Energies of the state, without a step and without E_col: contact is 0. */
CLOTH_API cloth_status cloth_sim_energy(cloth_sim *sim, cloth_ledger *ledger);
/* Potential and its gradient at x [nv x 3] by all terms but inertia, as statics sees it: h = 0, no
 * damping, wind a constant force lagged to the state, attachments at their targets. energy and
 * grad [nv x 3] N may be NULL; both untouched unless CLOTH_OK. For checkers and teachers. */
CLOTH_API cloth_status cloth_sim_potential(cloth_sim *sim, const double *x, double *energy,
                                           double *grad);

/* The groups that decide and the rung that each implies, for `tolerance` (m) at frame step h. The
 * stiffest region counts everywhere; triangles all of the mean size of the rest shape. */
CLOTH_API cloth_status cloth_advise(const cloth_desc *desc, double h, double tolerance,
                                    cloth_advice *advice);
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
 * Edge lengths agree with x to 1e-15 + 1.2e-16 long edge / short edge, relative.
 * contract: alloc none | cost O(nv + nf), 3 square roots a triangle | threads: distinct X */
CLOTH_API cloth_status cloth_flatten(int nv, const double *x, int nf, const int *faces, double *X);

/* --- mesh: generators --- */

/* Every generator and reader: *out is owned (cloth_mesh_destroy with the same hooks) and NULL on
 * failure; CLOTH_ERR_ARGUMENT names the argument: lengths in m and scales are 1e-70 .. 1e70;
 * CLOTH_ERR_MEMORY; alloc one block; O(size).
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
 * in   width, height  m */
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
 * in   meshes  [count] borrowed during the call; a fault is logged as meshes[i].field
 * returns also CLOTH_ERR_MESH, CLOTH_ERR_NONFINITE: from cloth_flatten; CLOTH_ERR_CAPACITY */
CLOTH_API cloth_status cloth_mesh_merge(const cloth_hooks *hooks, cloth_mesh *const *meshes,
                                        int count, cloth_mesh **out);

/* Closed, normals outward, centred at 0, without X; for obstacles. A box of size [3] m; a ball of
 * `around` vertices on its equator and a cylinder along y, both with poles, around >= 3.   [4.6] */
CLOTH_API cloth_status cloth_mesh_box(const cloth_hooks *hooks, const double size[3],
                                      cloth_mesh **out);
CLOTH_API cloth_status cloth_mesh_ball(const cloth_hooks *hooks, double radius, int around,
                                       cloth_mesh **out);
CLOTH_API cloth_status cloth_mesh_cylinder(const cloth_hooks *hooks, double radius, double height,
                                           int around, cloth_mesh **out);

/* For soups: a copy in which vertices within `distance` m (> 0) of an earlier one that stays are
 * that one. Faces that lose a corner go; X and parts stay with their faces, render corners and
 * names do not. _NONFINITE: a vertex. Then, as a rule:                                     [4.6] */
CLOTH_API cloth_status cloth_mesh_weld(const cloth_hooks *hooks, const cloth_mesh *mesh,
                                       double distance, cloth_mesh **out);
/* Turns faces, in place, until neighbours agree and closed pieces look outwards; an open piece
 * keeps the side of most of its faces. X of a turned face is mirrored. turned: how many, may be
 * NULL. _MESH: a strip with one side only. Edges of three faces are neither crossed nor boundary,
 * so that a lone copy of a face stays as it is.                                            [4.6] */
CLOTH_API cloth_status cloth_mesh_orient(const cloth_hooks *hooks, cloth_mesh *mesh, int *turned);

CLOTH_API void cloth_mesh_destroy(const cloth_hooks *hooks, cloth_mesh *mesh);
/* --- elements: one at a time, plain arrays (sections 6.1 to 6.4) ---
 * Shapes and units stand on each line. An output that is not wanted is NULL. Derivatives are exact
 * for psd == 0; psd != 0 asks for a positive semidefinite Hessian (the gradient does not change).
 * Hessians are full, symmetric and row-major. Finite in, finite out: an energy beyond the range of
 * doubles is returned as the largest double, a derivative array with such an entry is all zero.
 * Beyond lengths of 1e-150 .. 1e150 m the energy may be that or 0, derivatives zeros, too early.
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
 * the difference not wrapped; a sim's own hinges wrap it, where theta leaps from pi to -pi. grad
 * [12] N, hess [12x12] N/m; psd: Gauss-Newton.                                             [6.3] */
CLOTH_API double cloth_bend(const double *x, double c, double theta0, double *grad, double *hess,
                            int psd);

/* theta of that hinge, in [-pi, pi]: 0 when flat, positive when convex seen from the side that the
 * normals point to; any where a triangle has no area.                                     [6.3] */
CLOTH_API double cloth_dihedral(const double *x);

/* theta with its gradient [12] rad/m, and with its Hessian [12x12] rad/m^2. Return theta.  [6.3] */
CLOTH_API double cloth_dihedral_grad(const double *x, double *grad);
CLOTH_API double cloth_dihedral_hess(const double *x, double *grad, double *hess);

/* c = D e2 / (A1 + A2), N m: D N m plate rigidity, e2 m^2 squared rest length of the edge, A1 and
 * A2 m^2 rest areas. 0 when the areas are.                                                 [6.3] */
CLOTH_API double cloth_hinge_coefficient(double D, double e2, double A1, double A2);

/* Hinge without an angle, x [4x3] m as for cloth_bend: J = c/2 |sum_i w_i x_i|^2, c N m, w [4] 1/m
 * of sum 0. grad [12] N, hess [12x12] N/m: constant, positive semidefinite. For flat rest. [6.4] */
CLOTH_API double cloth_bend_quadratic(const double *x, const double *w, double c, double *grad,
                                      double *hess);

/* w [4] of the hinge at rest, x_rest [4x3] m, unfolded flat whatever its angle; zeros when a
 * triangle has no area.                                                                    [6.4] */
CLOTH_API void cloth_bend_quadratic_weights(const double *x_rest, double *w);

/* --- mesh: OBJ --- */

CLOTH_API cloth_obj_options cloth_obj_options_default(void);

/* Reads Wavefront OBJ text: v, vt, f (o, g or usemtl when asked); other keywords are skipped. [4.5]
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
 * contract: alloc the mesh and scratch | cost O(size), 0.2 to 0.5 us a number */
CLOTH_API cloth_status cloth_obj_parse(const cloth_hooks *hooks, const char *text, size_t size,
                                       const cloth_obj_options *options, cloth_mesh **out);

/* cloth_obj_parse of a file. Also CLOTH_ERR_IO; CLOTH_ERR_UNSUPPORTED under CLOTH_NO_STDIO. */
CLOTH_API cloth_status cloth_obj_load(const cloth_hooks *hooks, const char *path,
                                      const cloth_obj_options *options, cloth_mesh **out);

/* Writes a mesh as OBJ text, each number rounded to the fewest digits that read back as itself.
 * vt: the render corners; without them the pattern X, if any (read it with pattern_scale 1).
 * Parts become `g part0`, `g part1`, ... Call once with buf NULL for the size, then again.
 * out  buf     [capacity], no 0 at the end; NULL: only *needed
 * out  needed  bytes of the text, may be NULL
 * returns CLOTH_OK; CLOTH_ERR_CAPACITY: buf holds the first `capacity` bytes; CLOTH_ERR_ARGUMENT:
 *   NULL, an index of the mesh out of range; CLOTH_ERR_NONFINITE; CLOTH_ERR_MEMORY
 * contract: alloc scratch [nv + 3 nf] | cost O(size), 0.15 to 0.5 us a number */
CLOTH_API cloth_status cloth_obj_format(const cloth_hooks *hooks, const cloth_mesh *mesh,
                                        char *buf, size_t capacity, size_t *needed);

/* cloth_obj_format into a file. Also CLOTH_ERR_IO (what was written so far may be left);
 * CLOTH_ERR_UNSUPPORTED under CLOTH_NO_STDIO. */
CLOTH_API cloth_status cloth_obj_save(const cloth_hooks *hooks, const char *path,
                                      const cloth_mesh *mesh);

/* --- linear algebra --- */

/* Which blocks a matrix has, and the order of its rows.                                    [7.1]
 * in   nv       vertices, 1 .. CLOTH_MAX_COUNT
 * in   start    [nelem+1] from 0 or more, vertex [start[nelem]]: element e joins every pair of its
 *               vertices
 * in   x        [nv x 3] m where vertices are at rest: the better order; or NULL
 * out  *out     owned: cloth_pattern_destroy; const afterwards; NULL on failure
 * returns CLOTH_OK, CLOTH_ERR_ARGUMENT (a sentence names the index), CLOTH_ERR_MEMORY
 * contract: alloc yes | cost O(sum of squares of element sizes + aggregates x nv) */
CLOTH_API cloth_status cloth_pattern_create(const cloth_hooks *hooks, int nv, int nelem,
                                            const int *start, const int *vertex, const double *x,
                                            cloth_pattern **out);
CLOTH_API void   cloth_pattern_destroy(cloth_pattern *pattern);
CLOTH_API size_t cloth_pattern_bytes(const cloth_pattern *pattern);

/* A symmetric matrix of zeros over a pattern, which must outlive it.                       [7.2]
 * out  *out     owned: cloth_matrix_destroy; NULL on failure
 * returns CLOTH_OK, CLOTH_ERR_ARGUMENT, CLOTH_ERR_MEMORY */
CLOTH_API cloth_status cloth_matrix_create(const cloth_hooks *hooks, const cloth_pattern *pattern,
                                           cloth_matrix **out);
CLOTH_API void   cloth_matrix_destroy(cloth_matrix *A);
CLOTH_API size_t cloth_matrix_bytes(const cloth_matrix *A);
CLOTH_API void   cloth_matrix_clear(cloth_matrix *A);

/* Adds an element's matrix.                                                                [7.2]
 * in   v        [n] vertices; one may be named twice
 * in   H        [3n x 3n] symmetric; the blocks on and below the diagonal are read
 * Pairs outside the pattern are kept in a list until cloth_matrix_clear. One thread at a time.
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: a vertex out of range; CLOTH_ERR_MEMORY,
 *   CLOTH_ERR_CAPACITY: the list cannot grow. The matrix is as before on failure. */
CLOTH_API cloth_status cloth_matrix_add_element(cloth_matrix *A, int n, const int *v,
                                                const double *H);

/* y = A x in doubles, rows of fixed axes 0 (fixed [nv] bits 1 2 4, or NULL).               [7.2]
 * in   x        [nv x 3]       out  y [nv x 3], not x      contract: alloc none | serial */
CLOTH_API void cloth_matrix_mul(const cloth_matrix *A, const unsigned char *fixed, const double *x,
                                double *y);

/* Scratch for solving with matrices over a pattern, which must outlive it.                 [7.3]
 * out  *out     owned: cloth_linear_solver_destroy; NULL on failure
 * returns CLOTH_OK, CLOTH_ERR_ARGUMENT, CLOTH_ERR_MEMORY */
CLOTH_API cloth_status cloth_linear_solver_create(const cloth_hooks *hooks,
                                                  const cloth_pattern *pattern,
                                                  cloth_linear_solver **out);
CLOTH_API void   cloth_linear_solver_destroy(cloth_linear_solver *solver);
CLOTH_API size_t cloth_linear_solver_bytes(const cloth_linear_solver *solver);
CLOTH_API cloth_linear_options cloth_linear_options_default(void);

/* A x = b over the free axes.                                                             [7.3]
 * in   b        [nv x 3]; entries of fixed axes are not read; 0 where its squares underflow
 * out  x        [nv x 3], b is allowed; fixed axes 0; all 0 when the call fails but for _ARGUMENT
 * out  report   may be NULL
 * Where A is not positive on a direction that CG meets: report->negative; with a radius, x goes on
 * along it to the radius (hit); without, x is what was reached, or the preconditioned b where that
 * is nothing. Where a diagonal block, the coarse matrix or the factor already is not positive:
 * negative, not hit, and x = 0. Only JACOBI with a radius goes on, with a bound of the block as
 * preconditioner.
 * b.x >= 0 always: x goes downhill. Stopping at max_iterations is no failure: see the residual.
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: NULL, another pattern, a negative or NaN option, a radius
 *   of infinity; CLOTH_ERR_NONFINITE: NaN or infinity in A or b; CLOTH_ERR_MEMORY,
 *   CLOTH_ERR_CAPACITY: the factor is too large.
 * contract: alloc at the first call and where the pairs outside the pattern outgrew those before
 *   | cost per iteration ~ 2 passes over the lower triangle | same bits for any worker
 *   count | one call at a time per solver */
CLOTH_API cloth_status cloth_linear_solve(cloth_linear_solver *solver, const cloth_matrix *A,
                                          const double *b, double *x,
                                          const cloth_linear_options *options,
                                          cloth_linear_report *report);

/* ----- linear algebra: Cholesky ------------------------------------------------------- [7.4] - */

/* A factor of the pattern's fixed blocks and all diagonal blocks (those that extras brought
 * included; blocks outside the pattern are left out: use CLOTH_LINEAR_CHOLESKY then). */
typedef struct cloth_factor cloth_factor;

typedef struct cloth_factor_report {
    int    negative, zero;                  /* pivots; both 0: positive definite               */
    int    bad_vertex, bad_axis;            /* unknown of the first such pivot, -1: none       */
    double flops;                           /* multiplications and additions of one factor     */
    double entries;                         /* doubles in the factor                           */
} cloth_factor_report;

/* The elimination's plan. Memory for numbers is taken by the first compute.
 * returns CLOTH_OK, _ARGUMENT, _MEMORY, _CAPACITY */
CLOTH_API cloth_status cloth_factor_create(const cloth_hooks *hooks, const cloth_pattern *pattern,
                                           cloth_factor **out);
CLOTH_API void   cloth_factor_destroy(cloth_factor *f);              /* NULL is allowed        */
CLOTH_API size_t cloth_factor_bytes(const cloth_factor *f);

/* A + shift I = L S L' with S = diag(+-1), unknowns with a bit in fixed [nv] (NULL: none) left
 * out. By Sylvester's law the signs count the negative eigenvalues.
 * returns CLOTH_OK: positive definite; _NUMERIC: it is not, the report says how (not logged: the
 * caller often asks just that); _NONFINITE; _MEMORY.   no allocation after the first call [DR83] */
CLOTH_API cloth_status cloth_factor_compute(cloth_factor *f, const cloth_matrix *A,
                                            const unsigned char *fixed, double shift,
                                            cloth_factor_report *report);

/* x = (L S L')^-1 b, both [nv x 3] in vertex order, the same array allowed; fixed unknowns are 0.
 * _ARGUMENT without a computed factor.  cost 4 flops per entry */
CLOTH_API cloth_status cloth_factor_solve(cloth_factor *f, const double *b, double *x);

/* A direction d [nv x 3], |d| = 1, through the first pivot that is not positive; returns
 * d'(A + shift I)d: negative, or about 0. 0 and d = 0 for a positive definite matrix. */
CLOTH_API double cloth_factor_direction(cloth_factor *f, double *d);

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_IMPLEMENTED)
#define CLOTHSIM_IMPLEMENTED

#if defined(__FLT_EVAL_METHOD__) && (__FLT_EVAL_METHOD__ < 0 || __FLT_EVAL_METHOD__ == 2)
#error "clothsim.h needs doubles that are rounded to doubles: add -msse2 -mfpmath=sse"
#endif
#include <math.h>
#include <stdarg.h>
#include <string.h>
#ifndef CLOTH_NO_STDIO
#  include <stdio.h>
#endif
#ifndef CLOTH_MALLOC
#  include <stdlib.h>
#  define CLOTH_MALLOC(size) malloc(size)
#  define CLOTH_FREE(ptr)    free(ptr)
#endif
#if !defined(CLOTH_NO_SIMD) && defined(__AVX__)
#  include <immintrin.h>
#  define CLOTHI_AVX 1
#  define CLOTHI_SSE2 1
#elif !defined(CLOTH_NO_SIMD) && defined(__SSE2__)
#  include <emmintrin.h>
#  define CLOTHI_SSE2 1
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* MinGW's sqrt is x87's, rounded twice: one result in 4000 has another last bit. */
#if defined(__MINGW32__) && defined(__SSE2__)
static inline double clothi_sqrt(double a) {
    __asm__("sqrtsd %0, %0" : "+x"(a));
    return a;
}
#  define CLOTHI_OWN_SQRT 1
#  pragma push_macro("sqrt")
#  undef sqrt
#  define sqrt clothi_sqrt
#endif

#if defined(__GNUC__)
#  define CLOTHI_RESTRICT __restrict
#  define CLOTHI_UNUSED   __attribute__((unused))
#  define CLOTHI_OUTLINE  __attribute__((unused, noinline))   /* called often, never hot */
#else
#  define CLOTHI_RESTRICT
#  define CLOTHI_UNUSED
#  define CLOTHI_OUTLINE
#endif

/* clang: never inlined, because knowledge of the caller's arrays has led it to load them a round
 * ahead, which keeps a loop scalar. gcc -O3 loses a tenth of LEAPFROG's speed that way. */
#if defined(__clang__)
#  define CLOTHI_HOT static CLOTHI_UNUSED __attribute__((noinline))
#else
#  define CLOTHI_HOT static CLOTHI_UNUSED
#endif
#if defined(__GNUC__)
#  define CLOTHI_LANE static inline __attribute__((always_inline, unused))
#else
#  define CLOTHI_LANE static inline
#endif

/* What runs once, or once a step beside kernels that run for each element, is compiled for size and
 * without the passes that take gcc longest: 4 s and 300 KB are promises. One pragma only: a second
 * one would take back what the first has said. Without jump threading gcc warns of variables that
 * it takes for unset. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__OPTIMIZE__)
#  define CLOTHI_RARE_BEGIN                                                                       \
    _Pragma("GCC push_options")                                                                   \
    _Pragma("GCC optimize(\"Os\", \"no-tree-pre\", \"no-tree-vrp\", \"no-ivopts\",                \
        \"no-schedule-insns2\", \"no-gcse\", \"no-expensive-optimizations\",                      \
        \"no-code-hoisting\", \"no-tree-tail-merge\", \"no-tree-dominator-opts\",                 \
        \"no-tree-pta\", \"no-tree-slsr\", \"no-tree-loop-optimize\", \"no-tree-reassoc\")")
#  define CLOTHI_RARE_END _Pragma("GCC pop_options")
#else
#  define CLOTHI_RARE_BEGIN
#  define CLOTHI_RARE_END
#endif

/* ===== [3.1] SMALL MATHS ===================================================================== */

/* Finite by the exponent's bits: a host's fast-math cannot remove the test. */
CLOTHI_UNUSED static int clothi_finite(double a) {
    uint64_t bits;
    memcpy(&bits, &a, sizeof bits);
    return ((bits >> 52) & 0x7ffu) != 0x7ffu;
}

/* Index of the first entry of a [n] that is NaN or infinite, -1 when there is none. */
CLOTHI_OUTLINE static ptrdiff_t clothi_find_nonfinite(const double *a, size_t n) {
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

/* Normal of the face v [3] at x, twice its area long. */
CLOTHI_UNUSED static void clothi_face_cross(const double *x, const int *v, double *n) {
    double d[3], e[3];
    clothi_sub3(x + 3 * v[1], x + 3 * v[0], d);
    clothi_sub3(x + 3 * v[2], x + 3 * v[0], e);
    clothi_cross3(d, e, n);
}

CLOTHI_UNUSED static double clothi_max(double a, double b) { return a > b ? a : b; }
CLOTHI_UNUSED static double clothi_min(double a, double b) { return a < b ? a : b; }

/* The largest square of a distance between points a [n x 3] and b [n x 3]. */
CLOTHI_UNUSED static double clothi_apart2(const double *a, const double *b, int n) {
    double most = 0, d[3];
    int    i;
    for (i = 0; i < n; i++) {
        clothi_sub3(a + 3 * i, b + 3 * i, d);
        most = clothi_max(most, clothi_dot3(d, d));
    }
    return most;
}

/* What an energy beyond the range of doubles is answered with: the largest double. */
#define CLOTHI_HUGE 1.7976931348623157e308

/* An element's promise, finite out: zeroes a [n] when an entry is not finite. NULL is allowed. */
CLOTHI_UNUSED static void clothi_settle(double *a, size_t n) {
    if (a && clothi_find_nonfinite(a, n) >= 0) memset(a, 0, n * sizeof *a);
}

/* atan(w)/w - 1 from t = w^2, |w| <= tan(pi/8): t P(t) below. */
CLOTHI_UNUSED static inline double clothi_atan_tail(double t) {
    const double t2 = t * t;
    const double odd = -0.3333333333333333 + t2 * (-0.14285714284665682
        + t2 * (-0.0909090457530649 + t2 * (-0.06664510525508936
        + t2 * (-0.050854078345894844 + t2 * -0.019175404711104935))));
    const double even = 0.19999999999995516 + t2 * (0.11111111015187018
        + t2 * (0.07692183125376892 + t2 * (0.05858140904866328 + t2 * 0.03923044778479309)));
    return t * (odd + t * even);
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
    const double big = ax > ay ? ax : ay, low = ax > ay ? ay : ax;
    /* 0 or 1 by copysign: a constant in one arm of a ?: makes gcc build a branch for it */
    const double turned = 0.5 - copysign(0.5, 0.41421356237309503 * big - low);
    const double steep = 0.5 - copysign(0.5, ax - ay), left = 0.5 - copysign(0.5, x + 0.0);
    const double den = big + turned * low;
    const double w = (low - turned * big) / (den + 1e-300);
    const double a = w + w * clothi_atan_tail(w * w);
    const double k1 = turned + steep * (2.0 - 2.0 * turned);        /* pi/2 - angle */
    const double k2 = k1 + left * (4.0 - 2.0 * k1);                 /* pi - angle */
    const double sign = (1.0 - 2.0 * steep) * (1.0 - 2.0 * left);
    return copysign(k2 * 0.7853981633974483 + (sign * a + k2 * 3.061616997868383e-17), y);
}

#define CLOTHI_PI 3.14159265358979323846

/* cos and sin of a part of a turn, within 2 ulp of 1: libm's differ in last bits. */
CLOTHI_OUTLINE static void clothi_circle(double turns, double *c, double *s) {
    const double quarter = floor(4 * turns + 0.5), side = quarter - 4 * floor(quarter / 4);
    const double x = 2 * CLOTHI_PI * (turns - 0.25 * quarter), t = x * x;
    double       a = 1, b = 1;
    int          k;
    for (k = 18; k > 0; k -= 2) {           /* their series, |x| <= pi/4 */
        a = 1 - t / (k * (k - 1)) * a;
        b = 1 - t / (k * (k + 1)) * b;
    }
    b *= side < 2 ? x : -x, a = side < 2 ? a : -a;
    *c = side == 1 || side == 3 ? -b : a;
    *s = side == 1 || side == 3 ? a : b;
}

/* A difference of angles by at most one whole turn nearer to 0: into [-pi, pi] from 3 pi around. */
CLOTHI_UNUSED static inline double clothi_wrap(double angle) {
    const double turn = 0.5 - copysign(0.5, 3.141592653589793 - fabs(angle));
    return angle - turn * copysign(6.283185307179586, angle);
}

/* ===== [3.2] MEMORY, TEXT, RANGES ============================================================ */

/* Every block starts with a header that remembers its size (the free hook wants it) and is
 * aligned to 64 bytes, a cache line and the widest vector register in use. */
#define CLOTHI_ALIGN 64u

typedef struct clothi_block_header {
    void  *base;                            /* what the hook returned                          */
    size_t size;                            /* bytes asked of the hook                         */
} clothi_block_header;

static cloth_status clothi_fail(const cloth_hooks *h, cloth_status status, const char *text, ...);

/* count * size bytes, zeroed; NULL, and said here for all who ask, when the hook fails or the
 * product overflows. hooks may be NULL. count 0 gives a valid block. With half an allocator free()
 * would meet a host's block. */
CLOTHI_OUTLINE static void *clothi_alloc(const cloth_hooks *hooks, size_t count, size_t size) {
    const size_t extra = CLOTHI_ALIGN + sizeof(clothi_block_header);
    clothi_block_header header;
    unsigned char *base, *data;
    if (hooks && !hooks->allocator.alloc != !hooks->allocator.free) {
        clothi_fail(hooks, CLOTH_ERR_MEMORY, "hooks.allocator: set both alloc and free or neither");
        return NULL;
    }
    header.size = count * size + extra;
    header.base = size != 0 && count > ((size_t)-1 - extra) / size ? NULL
                  : hooks && hooks->allocator.alloc
                      ? hooks->allocator.alloc(header.size, hooks->allocator.user)
                      : CLOTH_MALLOC(header.size);
    if (!header.base) {
        clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %z times %z bytes", count, size);
        return NULL;
    }
    base = (unsigned char *)header.base;
    data = base + sizeof header;
    data += CLOTHI_ALIGN - 1u - ((uintptr_t)data + CLOTHI_ALIGN - 1u) % CLOTHI_ALIGN;
    memcpy(data - sizeof header, &header, sizeof header);
    memset(data, 0, count * size);
    return data;
}

/* Frees what clothi_alloc returned; NULL is allowed. */
CLOTHI_OUTLINE static void clothi_free(const cloth_hooks *hooks, const void *ptr) {
    clothi_block_header header;
    if (!ptr) return;
    memcpy(&header, (const unsigned char *)ptr - sizeof header, sizeof header);
    if (hooks && hooks->allocator.free)
        hooks->allocator.free(header.base, header.size, hooks->allocator.user);
    else
        CLOTH_FREE(header.base);
}

/* Bytes that the block of clothi_alloc holds from the hook; 0 for NULL. */
CLOTHI_OUTLINE static size_t clothi_block_size(const void *ptr) {
    clothi_block_header header;
    if (!ptr) return 0;
    memcpy(&header, (const unsigned char *)ptr - sizeof header, sizeof header);
    return header.size;
}

/* Bytes of n blocks, NULL allowed; frees them where hooks say how. */
CLOTHI_OUTLINE static size_t clothi_blocks(const cloth_hooks *hooks, const void *const *block,
                                           size_t n) {
    size_t i, sum = 0;
    for (i = 0; i < n; i++) {
        sum += clothi_block_size(block[i]);
        if (hooks) clothi_free(hooks, block[i]);
    }
    return sum;
}

typedef struct clothi_array {               /* an array to be                                  */
    void  *at;                              /* address of its pointer                          */
    size_t n, size;                         /* 0: none, NULL                                   */
} clothi_array;

/* Bytes of n arrays, at most 32, one behind the other; too many: 0. They are laid out where `block`
 * is (NULL: not yet). */
CLOTHI_UNUSED static size_t clothi_lay(const clothi_array *need, size_t n, void *block) {
    size_t i, bytes = 0;
    for (i = 0; i < n; i++) {
        void *made = block && need[i].n ? (char *)block + bytes : NULL;
        if (need[i].n > (size_t)-1 / 64 / need[i].size) return 0;
        if (block) memcpy(need[i].at, &made, sizeof made);
        bytes += (need[i].n * need[i].size + 15) / 16 * 16;
    }
    return bytes;
}

/* The same in a block of their own, zeroed: its address is that of the first. */
static cloth_status clothi_arrays(const cloth_hooks *hooks, const clothi_array *need, size_t n) {
    const size_t bytes = clothi_lay(need, n, NULL);
    void        *block = clothi_alloc(hooks, bytes ? bytes : (size_t)-1, 1);
    return block && clothi_lay(need, n, block) ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

CLOTHI_RARE_BEGIN

/* As FNV-1a, but 8 bytes at a time, with a shift that brings their high bits down; then the tail
 * byte by byte: equal bytes, equal hash. data NULL: zeros. */
CLOTHI_OUTLINE static uint64_t clothi_hash(uint64_t hash, const void *data, size_t size) {
    const unsigned char *p = (const unsigned char *)data;
    uint64_t             word = 0;
    for (; size >= 8; size -= 8) {
        if (p) memcpy(&word, p, 8), p += 8;
        hash = (hash ^ word) * 0x100000001b3u;
        hash ^= hash >> 29;
    }
    for (; size > 0; size--) hash = (hash ^ (p ? *p++ : 0u)) * 0x100000001b3u;
    return hash;
}

/* An object that begins with its hooks, zeroed; NULL: no memory. */
static void *clothi_object(const cloth_hooks *hooks, size_t size) {
    void *object = clothi_alloc(hooks, 1, size);
    if (object && hooks) memcpy(object, hooks, sizeof *hooks);
    return object;
}

/* Bytes of such an object and of the n blocks whose pointers come first behind its hooks; NULL: 0.
 * Frees them all where `done`. */
static size_t clothi_object_blocks(const void *object, size_t n, int done) {
    cloth_hooks hooks;
    size_t      k, sum = 0;
    if (!object) return 0;
    memcpy(&hooks, object, sizeof hooks);
    for (k = 0; k <= n; k++) {
        const void *block = object;         /* itself last                                     */
        if (k < n)
            memcpy(&block, (const unsigned char *)object + sizeof hooks + k * sizeof block,
                   sizeof block);
        sum += clothi_blocks(done ? &hooks : NULL, &block, 1);
    }
    return sum;
}

/* Where text goes: counted beyond the capacity, kept within. No printf: its output depends on the
 * locale and the host may lack it. */
typedef struct clothi_sink {
    char  *buf;
    size_t capacity, n;
} clothi_sink;

CLOTHI_OUTLINE static void clothi_sink_char(clothi_sink *s, char c) {
    if (s->n < s->capacity) s->buf[s->n] = c;
    s->n++;
}

CLOTHI_OUTLINE static void clothi_sink_string(clothi_sink *s, const char *text) {
    while (text && *text) clothi_sink_char(s, *text++);
}

static void clothi_sink_uint(clothi_sink *t, uint64_t u) {
    char digits[24];
    int  n = 0;
    do {
        digits[n++] = (char)('0' + (int)(u % 10u));
        u /= 10u;
    } while (u);
    while (n) clothi_sink_char(t, digits[--n]);
}

CLOTHI_OUTLINE static void clothi_sink_int(clothi_sink *t, long long i) {
    if (i < 0) clothi_sink_char(t, '-');
    clothi_sink_uint(t, i < 0 ? (uint64_t)0 - (uint64_t)i : (uint64_t)i);
}

static void clothi_sink_number(clothi_sink *t, double a, int digits, int least, int most);

/* A sentence: %s text, %i int, %z size_t, %g double in six digits, enough to recognise it. */
static void clothi_sentence(const cloth_hooks *hooks, cloth_log_level level, cloth_status status,
                            const char *format, va_list args) {
    char        buf[256];
    clothi_sink t = {NULL, sizeof buf - 1, 0};
    if (!hooks || !hooks->log.fn) return;
    for (t.buf = buf; *format; format++) {
        if (*format != '%') {
            clothi_sink_char(&t, *format);
            continue;
        }
        switch (*++format) {
        case 's': clothi_sink_string(&t, va_arg(args, const char *)); break;
        case 'i': clothi_sink_int(&t, va_arg(args, int)); break;
        case 'z': clothi_sink_uint(&t, va_arg(args, size_t)); break;
        case 'g': clothi_sink_number(&t, va_arg(args, double), 6, -3, 6); break;
        default: clothi_sink_char(&t, '%'); format -= *format == '\0'; break;
        }
    }
    buf[t.n < t.capacity ? t.n : t.capacity] = '\0';
    hooks->log.fn(level, status, buf, hooks->log.user);
}

CLOTHI_OUTLINE static void clothi_say(const cloth_hooks *hooks, cloth_log_level level,
                                      cloth_status status, const char *format, ...) {
    va_list args;
    va_start(args, format);
    clothi_sentence(hooks, level, status, format, args);
    va_end(args);
}

CLOTH_API void cloth_log_stderr(cloth_log_level level, cloth_status status, const char *text,
                                void *user) {
    const char *part[5] = {level == CLOTH_LOG_ERROR ? "error: " : "warning: ", text, " (",
                           cloth_status_text(status), ")\n"};
    int         i;
    for (i = 0; i < 5 && text; i++) {
#ifndef CLOTH_NO_STDIO
        (void)fwrite(part[i], 1, strlen(part[i]), stderr);
#endif
    }
    (void)user, (void)part;
}

/* Logs an error sentence and returns its status: `return clothi_fail(hooks, CLOTH_ERR_..., ...)` */
CLOTHI_OUTLINE static cloth_status clothi_fail(const cloth_hooks *hooks, cloth_status status,
                                               const char *format, ...) {
    va_list args;
    va_start(args, format);
    clothi_sentence(hooks, CLOTH_LOG_ERROR, status, format, args);
    va_end(args);
    return status;
}

/* Refuses a call for what it was not given. */
CLOTHI_OUTLINE static cloth_status clothi_null(const cloth_hooks *hooks, const char *what) {
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s is NULL", what);
}

/* --- what a call or desc may say. A refusal names field and value; who: what stands before the
 * field --- */

enum { CLOTHI_OVER = 1, CLOTHI_UNDER = 2 }; /* low, or high, itself is refused                 */

CLOTHI_OUTLINE static cloth_status clothi_check_range(const cloth_hooks *hooks, const char *who,
                                                      const char *field, double a, double low,
                                                      double high, int open) {
    const int under = open & CLOTHI_OVER ? !(a > low) : a < low;
    if (!clothi_finite(a))
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "%s%s = %g is not finite", who, field, a);
    if (!under && (open & CLOTHI_UNDER ? a < high : a <= high)) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s%s = %g must be %s %g", who, field, a,
                       under ? open & CLOTHI_OVER ? "above" : "at least"
                             : open & CLOTHI_UNDER ? "below" : "at most", under ? low : high);
}

CLOTHI_OUTLINE static cloth_status clothi_check_count(const cloth_hooks *hooks, const char *who,
                                                      const char *field, int n, int low, int high) {
    if (n >= low && n <= high) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s%s = %i must be %i to %i", who, field, n, low,
                       high);
}

/* The numbers of a struct: a table of them, each `n` doubles from byte `at` on; n = 0: an int. */
typedef struct clothi_rule {
    char   field[16];
    int    n, open;
    double low, high;
    size_t at;
} clothi_rule;

#define CLOTHI_RULE(type, field, n, open, low, high)                                             \
    {#field, n, open, low, high, offsetof(type, field)}

static cloth_status clothi_check_rules(const cloth_hooks *hooks, const char *who, const void *of,
                                       const clothi_rule *rule, size_t count) {
    cloth_status status = CLOTH_OK;
    double       a[3];
    int          k, whole;
    for (; count > 0 && !status; count--, rule++) {
        const unsigned char *at = (const unsigned char *)of + rule->at;
        memcpy(&whole, at, sizeof whole);
        memcpy(a, at, (size_t)rule->n * sizeof *a);
        for (k = 0; k < rule->n && !status; k++)
            status = clothi_check_range(hooks, who, rule->field, a[k], rule->low, rule->high,
                                        rule->open);
        if (rule->n == 0)
            status = clothi_check_count(hooks, who, rule->field, whole, (int)rule->low,
                                        (int)rule->high);
    }
    return status;
}

/* Each number of a [n]; NULL: nothing to check. */
CLOTHI_OUTLINE static cloth_status clothi_check_each(const cloth_hooks *hooks, const char *name,
                                                     const double *a, int n, double low,
                                                     int open) {
    ptrdiff_t at = a ? clothi_find_nonfinite(a, (size_t)n) : -1;
    if (at >= 0)
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "%s[%i] = %g is not finite", name, (int)at,
                           a[at]);
    for (at = 0; a && at < n && (open ? a[at] > low : a[at] >= low); at++) {}
    if (!a || at == n) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s[%i] = %g must be %s %g", name, (int)at, a[at],
                       open ? "above" : "at least", low);
}

CLOTHI_OUTLINE static cloth_status clothi_check_vector(const cloth_hooks *hooks, const char *name,
                                                       const double *a, int n) {
    return clothi_check_each(hooks, name, a, n, -HUGE_VAL, 0);
}

/* Each index of list [n x width] is in [0, end); NULL: nothing to check. */
CLOTHI_OUTLINE static cloth_status clothi_check_indices(const cloth_hooks *hooks,
                                                        cloth_status status, const char *who,
                                                        const char *name, const int *list, int n,
                                                        int width, int end) {
    int i;
    for (i = 0; list && i < n * width && list[i] >= 0 && list[i] < end; i++) {}
    if (!list || i >= n * width) return CLOTH_OK;
    if (width == 1)
        return clothi_fail(hooks, status, "%s%s[%i] = %i is outside 0 .. %i", who, name, i, list[i],
                           end - 1);
    return clothi_fail(hooks, status, "%s%s[%i] corner %i = %i is outside 0 .. %i", who, name,
                       i / width, i % width, list[i], end - 1);
}

/* "list[at]." in name; "" where at < 0. */
static const char *clothi_member(char name[32], const char *list, int at) {
    clothi_sink s = {NULL, 31, 0};
    s.buf = name;
    if (at >= 0) {
        clothi_sink_string(&s, list);
        clothi_sink_char(&s, '[');
        clothi_sink_int(&s, at);
        clothi_sink_string(&s, "].");
    }
    name[s.n < 31 ? s.n : 31] = '\0';
    return name;
}

/* fn over [0, count) in ranges of about `grain` items; serial without a parallel hook. */
CLOTHI_OUTLINE static void clothi_for(const cloth_hooks *hooks, int count, int grain,
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

/* Asks the host whether to go on; *finish (NULL: goes on) when it shall end here. */
CLOTHI_UNUSED static cloth_status clothi_cancelled(const cloth_hooks *hooks, int *finish) {
    const int answer = hooks->cancel.fn ? hooks->cancel.fn(hooks->cancel.user) : 0;
    if (answer == 2 && finish) *finish = 1;
    return answer && answer != 2 ? CLOTH_ERR_CANCELLED : CLOTH_OK;
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
 * and a remedy, all in one call. Two passes: numbers and corners face by face; edges, and copies
 * of a face, by sorting half-edges (sort and pass serve [4.2] too).
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
    double l, p, q;     /* m                                                                   */
    double shape;       /* height / longest edge                                               */
} clothi_triangle;

/* Four sums side by side: no addition waits for the one before it. */
CLOTHI_OUTLINE static double clothi_dot(const double *a, const double *b, size_t n) {
    double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    size_t i;
    for (i = 0; i + 4 <= n; i += 4) {
        s0 += a[i] * b[i];
        s1 += a[i + 1] * b[i + 1];
        s2 += a[i + 2] * b[i + 2];
        s3 += a[i + 3] * b[i + 3];
    }
    for (; i < n; i++) s0 += a[i] * b[i];
    return (s0 + s1) + (s2 + s3);
}

/* Largest magnitude of a [n]. */
CLOTHI_OUTLINE static double clothi_max_abs(const double *a, int n) {
    double big = 0;
    int    i;
    for (i = 0; i < n; i++) big = clothi_max(fabs(a[i]), big);
    return big;
}

/* Corners a, b, c, finite. Works on numbers scaled by a power of two, so that no square over- or
 * underflows. Returns 0 when degenerate (or when its size overflows), else 1 and *t. */
static int clothi_triangle_shape(const double *a, const double *b, const double *c,
                                 clothi_triangle *t) {
    double e[9], n[3], size, back, l, p, q, d2, d12, longest, coord, height;
    double *d = e + 3, *g = e + 6;
    int    k, exponent;
    for (k = 0; k < 3; k++) {               /* quarters: the difference cannot overflow        */
        e[k] = 0.25 * b[k] - 0.25 * a[k], d[k] = 0.25 * c[k] - 0.25 * a[k];
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
    q = sqrt(clothi_dot3(n, n)) / l;
    p = d12 < d2 ? l + clothi_dot3(e, g) / l : clothi_dot3(e, d) / l;
    height = l * q / longest;
    if (!(height > CLOTHI_EPS_AREA * longest && height > CLOTHI_EPS_COORD * coord)) return 0;
    back = ldexp(1.0, exponent) * 4.0;
    t->shape = height / longest;
    t->l = l * back, t->p = p * back, t->q = q * back;
    return clothi_finite(t->l) && clothi_finite(t->p) && clothi_finite(t->q);
}

static int clothi_halfedge_next(int h) { return h % 3 == 2 ? h - 2 : h + 1; }

/* out = the items of `in` (NULL: 0, 1, 2, ...) sorted by key[item] in [0, nkeys), equal keys in
 * the order of `in`; those of key k begin at start[k], [nkeys + 1]. The sort of a whole record is
 * one call per field, the least important first. */
static void clothi_sort_by(int n, int nkeys, const int *key, const int *in, int *out, int *start) {
    int i;
    memset(start, 0, ((size_t)nkeys + 1u) * sizeof *start);
    for (i = 0; i < n; i++) start[key[in ? in[i] : i]]++;
    for (i = 0; i < nkeys; i++) start[i + 1] += start[i];
    for (i = n - 1; i >= 0; i--) {          /* from its end back to its start                  */
        const int item = in ? in[i] : i;
        out[--start[key[item]]] = item;
    }
}

/* Half-edges sorted by their vertices (smaller, larger), then by number. */
typedef struct clothi_edge_sort {
    int *lo, *hi;       /* [3 nf] smaller and larger end of each half-edge; lo: to be freed    */
    int *order;         /* [3 nf] half-edges; those of one edge stand together                 */
    int *work;          /* [3 nf] scratch; clothi_check_edges(): the corners' union-find, -1: of
                           a copy of a face                                                    */
    int *count;         /* [nv + 1] scratch; there: the last half-edge seen from this corner   */
} clothi_edge_sort;

/* Every index of faces is in [0, nv). */
static cloth_status clothi_edge_sort_make(const cloth_hooks *hooks, int nv, int nf,
                                          const int *faces, clothi_edge_sort *s) {
    const size_t n = 3 * (size_t)nf;
    int h;
    s->lo = (int *)clothi_alloc(hooks, 4 * n + (size_t)nv + 1u, sizeof(int));
    if (!s->lo) return CLOTH_ERR_MEMORY;
    s->hi = s->lo + n, s->order = s->hi + n, s->work = s->order + n, s->count = s->work + n;
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
    const cloth_status status = clothi_check_count(hooks, "", "nv", nv, 0, CLOTH_MAX_COUNT);
    return status ? status : clothi_check_count(hooks, "", "nf", nf, 0, CLOTH_MAX_COUNT);
}

typedef struct clothi_checker {
    const cloth_hooks *hooks;
    cloth_mesh_report  report;
    int     nv, nf;
    const double *x, *X;
    const int    *faces;
    const int    *kept; /* [nf x 3] faces, zeros in place of those whose edges are not looked at */
    int    *corners;    /* [nv] corners at a vertex, of any face                               */
    int    *fans;       /* [nv] fans at a vertex; NULL: not wanted, the first fault is enough  */
    int     ne;         /* edges                                                               */
} clothi_checker;

static const struct { cloth_log_level level; cloth_status status; const char *text; }
clothi_faults[] = {
#define CLOTH_X(name, value, error, text)                                                        \
    {error ? CLOTH_LOG_ERROR : CLOTH_LOG_WARNING, !error ? CLOTH_OK :                            \
     value == CLOTH_MESH_NONFINITE ? CLOTH_ERR_NONFINITE : CLOTH_ERR_MESH, text},
    CLOTH_MESH_FAULT_LIST(CLOTH_X)
#undef CLOTH_X
};

/* Counts a fault; the first few of a kind are spelled out. */
static void clothi_fault(clothi_checker *c, cloth_mesh_fault kind, int index, const char *format,
                         ...) {
    va_list args;
    if (c->report.count[kind] == 0) c->report.first[kind] = index;
    if (clothi_faults[kind].level == CLOTH_LOG_ERROR) c->report.errors++;
    else c->report.warnings++;
    if (c->report.count[kind]++ >= CLOTH_MESH_FAULTS_LOGGED) return;
    va_start(args, format);
    clothi_sentence(c->hooks, clothi_faults[kind].level, clothi_faults[kind].status, format, args);
    va_end(args);
}

static void clothi_check_numbers(clothi_checker *c) {
    static const char *const axis[] = {"x", "y", "z"};
    int i;
    for (i = 0; i < 3 * c->nv; i++)
        if (!clothi_finite(c->x[i]))
            clothi_fault(c, CLOTH_MESH_NONFINITE, i, "vertex %i: %s is %g: give it a number",
                         i / 3, axis[i % 3], c->x[i]);
    for (i = 0; c->X && i < 6 * c->nf; i++)
        if (!clothi_finite(c->X[i]))
            clothi_fault(c, CLOTH_MESH_NONFINITE, 3 * c->nv + i,
                         "pattern: corner %i of face %i: %s is %g: give it a number", i / 2 % 3,
                         i / 6, axis[i % 2], c->X[i]);
}

/* Pattern corners P [3 x 2], finite, of face f: a counter-clockwise triangle. */
static void clothi_check_pattern(clothi_checker *c, int f, const double *P) {
    const double    P3[9] = {P[0], P[1], 0, P[2], P[3], 0, P[4], P[5], 0};
    clothi_triangle t;
    if (!clothi_triangle_shape(P3, P3 + 3, P3 + 6, &t))
        clothi_fault(c, CLOTH_MESH_PATTERN, f, "pattern: face %i has no area: move its corners "
                     "apart or leave the pattern out", f);
    else if ((0.5 * P[2] - 0.5 * P[0]) * (0.5 * P[5] / t.q - 0.5 * P[1] / t.q) <
             (0.5 * P[4] - 0.5 * P[0]) * (0.5 * P[3] / t.q - 0.5 * P[1] / t.q))
        clothi_fault(c, CLOTH_MESH_PATTERN, f, "pattern: face %i is mirrored (negative area): "
                     "mirror its panel or reverse its corners", f);
}

/* One face: indices, corners, area, pattern. True when its edges can be looked at. */
static int clothi_check_face(clothi_checker *c, int f) {
    const int      *t = c->faces + 3 * f;
    clothi_triangle s;
    int             k, bad = 0, finite = 1;
    for (k = 0; k < 3; k++) {
        if (t[k] < 0 || t[k] >= c->nv) {
            bad = 1;
            clothi_fault(c, CLOTH_MESH_INDEX, f, "face %i: corner %i = %i but nv = %i: use 0 .. "
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
        clothi_fault(c, CLOTH_MESH_REPEATED, f, "face %i: corners %i %i %i repeat a vertex: "
                     "remove the face", f, t[0], t[1], t[2]);
        return 0;
    }
    if (!finite) return 1;
    if (!clothi_triangle_shape(c->x + 3 * t[0], c->x + 3 * t[1], c->x + 3 * t[2], &s))
        clothi_fault(c, CLOTH_MESH_ZERO_AREA, f, "face %i: corners %i %i %i span no area: "
                     "move one or merge vertices and remove the face", f, t[0], t[1], t[2]);
    else if (s.shape < CLOTHI_SLIVER)
        clothi_fault(c, CLOTH_MESH_SLIVER, f, "face %i: a sliver, %g times longer than high:"
                     " it will be stiff; remesh there", f, 1 / s.shape);
    return 1;
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

/* The corner opposite half-edge h. */
static int clothi_opposite(const int *faces, int h) {
    return faces[clothi_halfedge_next(clothi_halfedge_next(h))];
}

/* Takes copies of a face out of the half-edges order[i .. end) of an edge; returns how many stay.
 * A face and its copy share all edges: the first of these shows it, before anything is counted. */
static int clothi_drop_copies(clothi_checker *c, const clothi_edge_sort *s, int i, int end) {
    int j, k, n = i;
    for (j = i; j < end; j++) {
        const int h = s->order[j], corner = clothi_opposite(c->kept, h), g = s->count[corner];
        if (s->work[h] < 0) continue;
        if (g < h && s->lo[g] == s->lo[h] && s->hi[g] == s->hi[h] &&
            clothi_opposite(c->kept, g) == corner) {
            clothi_fault(c, CLOTH_MESH_DUPLICATE, h / 3, "face %i has the corners of face %i: "
                         "remove one of them", h / 3, g / 3);
            for (k = 0; k < 3; k++) s->work[h / 3 * 3 + k] = -1;
        } else {
            s->order[n++] = s->count[corner] = h;
        }
    }
    return n - i;
}

/* Counts edges and fans and names the faults of edges. */
static void clothi_check_edges(clothi_checker *c, const clothi_edge_sort *s) {
    int *parent = s->work;
    int  i, j, end, faces, n = 3 * c->nf;
    for (i = 0; i < n; i++) parent[i] = i;
    memset(s->count, 0, (size_t)c->nv * sizeof(int));
    for (i = 0; i < n && (c->fans || c->report.errors == 0); i = end) {
        const int g = s->order[i], *at = s->order + i, a = s->lo[g], b = s->hi[g];
        end = clothi_edge_run(s, n, i);
        if (a == b) continue;               /* not kept                                        */
        c->ne++;
        faces = clothi_drop_copies(c, s, i, end);
        for (j = 0; c->fans && j < faces; j++) {
            c->fans[c->kept[at[j]]]++;
            c->fans[a] -= clothi_join(parent, clothi_corner_at(c->kept, at[0], a),
                                      clothi_corner_at(c->kept, at[j], a));
            c->fans[b] -= clothi_join(parent, clothi_corner_at(c->kept, at[0], b),
                                      clothi_corner_at(c->kept, at[j], b));
        }
        if (faces > 2)
            clothi_fault(c, CLOTH_MESH_THREE_FACES, at[0] / 3, "edge %i-%i has %i faces, among "
                         "them %i, %i and %i: cut all but two off by doubling its vertices", a, b,
                         faces, at[0] / 3, at[1] / 3, at[2] / 3);
        else if (faces == 2 && c->kept[at[0]] == c->kept[at[1]])
            clothi_fault(c, CLOTH_MESH_ORIENTATION, at[0] / 3, "faces %i and %i both run %i -> %i:"
                         " reverse the corners of one (a one-sided surface must be cut)",
                         at[0] / 3, at[1] / 3, c->kept[at[0]],
                         c->kept[clothi_halfedge_next(at[0])]);
    }
}

static cloth_status clothi_check_surface(clothi_checker *c) {
    clothi_edge_sort sort;
    int              v;
    cloth_status     status = clothi_edge_sort_make(c->hooks, c->nv, c->nf, c->kept, &sort);
    if (status != CLOTH_OK) return status;
    clothi_check_edges(c, &sort);
    for (v = 0; v < c->nv; v++) {
        if (c->corners[v] == 0)
            clothi_fault(c, CLOTH_MESH_ISOLATED, v, "vertex %i has no face: it moves as a point"
                         " of the first corner's mass; remove it", v);
        else if (c->fans[v] > 1)
            clothi_fault(c, CLOTH_MESH_BOW_TIE, v, "vertex %i joins %i surfaces in a point: "
                         "double it, or accept a ball joint", v, c->fans[v]);
    }
    clothi_free(c->hooks, sort.lo);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_mesh_check(const cloth_hooks *hooks, int nv, const double *x, int nf,
                                        const int *faces, const double *X,
                                        cloth_mesh_report *report) {
    clothi_checker c;
    cloth_status   status;
    int            f, k, *kept;
    memset(&c, 0, sizeof c);
    if (report) *report = c.report;
    status = clothi_check_counts(hooks, nv, nf);
    if (status != CLOTH_OK) return status;
    if (nv == 0 || nf == 0)
        return clothi_fail(hooks, CLOTH_ERR_MESH, "the mesh has %i vertices and %i faces", nv, nf);
    if (!x || !faces)
        return clothi_null(hooks, x ? "cloth_mesh_check: faces" : "cloth_mesh_check: x");
    c.hooks = hooks, c.nv = nv, c.nf = nf, c.x = x, c.X = X, c.faces = faces;
    for (k = 0; k < CLOTH_MESH_FAULT_COUNT; k++) c.report.first[k] = -1;
    c.kept = kept = (int *)clothi_alloc(hooks, 3 * (size_t)nf + 2 * (size_t)nv, sizeof(int));
    if (!kept) return CLOTH_ERR_MEMORY;
    c.corners = kept + 3 * (size_t)nf;
    c.fans = c.corners + nv;
    clothi_check_numbers(&c);
    for (f = 0; f < nf; f++)
        if (clothi_check_face(&c, f)) memcpy(kept + 3 * f, faces + 3 * f, 3 * sizeof(int));
    status = clothi_check_surface(&c);
    clothi_free(hooks, kept);
    if (status != CLOTH_OK) return status;
    for (k = 0; k < CLOTH_MESH_FAULT_COUNT; k++)
        if (c.report.count[k] > CLOTH_MESH_FAULTS_LOGGED)
            clothi_say(hooks, clothi_faults[k].level, clothi_faults[k].status,
                       "%s: %i in all, %i not listed", clothi_faults[k].text, c.report.count[k],
                       c.report.count[k] - CLOTH_MESH_FAULTS_LOGGED);
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
static cloth_status clothi_check_faces(const cloth_hooks *hooks, int nv, int nf, const int *faces) {
    const cloth_status status = clothi_check_indices(hooks, CLOTH_ERR_MESH, "", "faces", faces, nf,
                                                     3, nv);
    int f;
    for (f = 0; f < nf && !status; f++) {
        const int *t = faces + 3 * f;
        if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0])
            return clothi_fail(hooks, CLOTH_ERR_MESH, "faces[%i] = %i %i %i repeats a corner", f,
                               t[0], t[1], t[2]);
    }
    return status;
}

/* The struct and its arrays in one block. Loops: at most one vertex per boundary edge and at
 * least three edges per loop. */
static cloth_topology *clothi_topology_alloc(const cloth_hooks *hooks, int nv, int nf, int ne,
                                             int nh) {
    const size_t v = (size_t)nv + 1, f = (size_t)nf, e = (size_t)ne, one = sizeof(int);
    const size_t h = (size_t)nh + 1, b = (size_t)(ne - nh) + 1;     /* of none there is an array */
    cloth_topology t, *made;
    const clothi_array need[] = {
        {&made, 1, sizeof t}, {&t.edges, 2 * e, one}, {&t.edge_faces, 2 * e, one},
        {&t.face_edges, 3 * f, one}, {&t.hinges, 4 * h, one}, {&t.hinge_edge, h, one},
        {&t.hinge_faces, 2 * h, one}, {&t.loop_start, b / 3 + 1, one}, {&t.loop_vertex, b, one},
        {&t.vf_start, v, one}, {&t.vf, 3 * f, one}, {&t.vv_start, v, one}, {&t.vv, 2 * e, one}};
    memset(&t, 0, sizeof t);
    if (clothi_arrays(hooks, need, sizeof need / sizeof *need)) return NULL;
    t.nv = nv, t.nf = nf, t.ne = ne, t.nh = nh;
    *made = t;
    return made;
}

static void clothi_topology_edges(const int *faces, const clothi_edge_sort *s, cloth_topology *t) {
    int i, end, e = 0, j = 0;
    for (i = 0; i < 3 * t->nf; i = end, e++) {
        const int g = s->order[i], h = i + 1 < 3 * t->nf ? s->order[i + 1] : 0;
        const int turned = faces[g] != s->lo[g], left = turned ? h : g, right = turned ? g : h;
        end = clothi_edge_run(s, 3 * t->nf, i);
        t->edges[2 * e] = s->lo[g];
        t->edges[2 * e + 1] = s->hi[g];
        t->edge_faces[2 * e] = g / 3;
        t->edge_faces[2 * e + 1] = -1;
        t->face_edges[g] = e;
        if (end - i == 1) continue;
        t->face_edges[h] = e;
        t->edge_faces[2 * e] = t->hinge_faces[2 * j] = left / 3;
        t->edge_faces[2 * e + 1] = t->hinge_faces[2 * j + 1] = right / 3;
        t->hinges[4 * j] = s->lo[g];
        t->hinges[4 * j + 1] = s->hi[g];
        t->hinges[4 * j + 2] = clothi_opposite(faces, left);
        t->hinges[4 * j + 3] = clothi_opposite(faces, right);
        t->hinge_edge[j++] = e;
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

/* Edges come sorted, so each vertex meets its smaller neighbours first, each kind in order. */
static void clothi_topology_incidence(const int *faces, cloth_topology *t) {
    int i;
    clothi_sort_by(3 * t->nf, t->nv, faces, NULL, t->vf, t->vf_start);
    for (i = 0; i < 3 * t->nf; i++) t->vf[i] /= 3;
    clothi_sort_by(2 * t->ne, t->nv, t->edges, NULL, t->vv, t->vv_start);
    for (i = 0; i < 2 * t->ne; i++) t->vv[i] = t->edges[t->vv[i] ^ 1];
}

CLOTH_API cloth_status cloth_topology_create(const cloth_hooks *hooks, int nv, int nf,
                                             const int *faces, cloth_topology **out) {
    clothi_edge_sort sort;
    clothi_checker   c;
    cloth_status     status;
    if (!out) return clothi_null(hooks, "cloth_topology_create: out");
    *out = NULL;
    if (!faces && nf > 0)
        return clothi_null(hooks, "cloth_topology_create: faces");
    status = clothi_check_counts(hooks, nv, nf);
    if (!status) status = clothi_check_faces(hooks, nv, nf, faces);
    if (!status) status = clothi_edge_sort_make(hooks, nv, nf, faces, &sort);
    if (status) return status;
    memset(&c, 0, sizeof c);
    c.hooks = hooks, c.nv = nv, c.nf = nf, c.kept = faces;
    clothi_check_edges(&c, &sort);
    if (c.report.errors) status = CLOTH_ERR_MESH;
    else if (!(*out = clothi_topology_alloc(hooks, nv, nf, c.ne, 3 * nf - c.ne)))
        status = CLOTH_ERR_MEMORY;
    if (*out) {
        clothi_topology_edges(faces, &sort, *out);
        memset(sort.work, 0, 3 * (size_t)nf * sizeof(int));         /* ne <= 3 nf */
        clothi_topology_loops(faces, *out, sort.work);
        clothi_topology_incidence(faces, *out);
    }
    clothi_free(hooks, sort.lo);
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

/* All arrays of a mesh in one block; npart, nr or text 0: without these. */
static cloth_mesh *clothi_mesh_alloc(const cloth_hooks *hooks, int nv, int nf, int with_X,
                                     int npart, int nr, size_t text) {
    const size_t f = (size_t)nf, r = (size_t)nr, one = sizeof(int), real = sizeof(double);
    cloth_mesh   m, *made;
    const clothi_array need[] = {
        {&made, 1, sizeof m}, {&m.x, 3 * (size_t)nv, real}, {&m.X, with_X ? 6 * f : 0, real},
        {&m.vt, 2 * r, real}, {&m.faces, 3 * f, one}, {&m.part, npart ? f : 0, one},
        {&m.render_vertex, r, one}, {&m.render_faces, r ? 3 * f : 0, one}, {&m.names, text, 1}};
    memset(&m, 0, sizeof m);
    if (clothi_arrays(hooks, need, sizeof need / sizeof *need)) return NULL;
    m.nv = nv, m.nf = nf, m.npart = npart, m.nr = nr;
    *made = m;
    return made;
}

CLOTH_API void cloth_mesh_destroy(const cloth_hooks *hooks, cloth_mesh *mesh) {
    clothi_free(hooks, mesh);
}

/* Where products and squares of quotients stay in the range of doubles. */
static cloth_status clothi_check_size(const cloth_hooks *hooks, const char *name, double a) {
    if (a >= 1e-70 && a <= 1e70) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s = %g must be 1e-70 to 1e70", name, a);
}

/* What a generator is given: a size in m, or (least > 0) a number of vertices or rings. */
typedef struct clothi_given {
    const char *name;
    double      size;
    int         n, least;
} clothi_given;

/* How every generator begins: refusals, then a mesh to fill. nv and nf are computed in double, so
 * that no product overflows on the way. */
static cloth_status clothi_generate(const cloth_hooks *hooks, const char *call,
                                    const clothi_given *given, int count, double nv, double nf,
                                    int with_X, cloth_mesh **out) {
    const clothi_given *q;
    if (!out) return clothi_null(hooks, call);
    *out = NULL;
    for (q = given; q < given + count; q++) {
        if (q->least == 0 && clothi_check_size(hooks, q->name, q->size)) return CLOTH_ERR_ARGUMENT;
        if (q->n < q->least)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s = %i must be at least %i", q->name,
                               q->n, q->least);
    }
    if (nv > CLOTH_MAX_COUNT || nf > CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "%g vertices and %g faces: at most %i of each", nv, nf, CLOTH_MAX_COUNT);
    *out = clothi_mesh_alloc(hooks, (int)nv, (int)nf, with_X, 0, 0, 0);
    return *out ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

/* Appends face a b c at *f. */
static void clothi_add_face(cloth_mesh *m, int *f, int a, int b, int c) {
    int *t = m->faces + 3 * (*f)++;
    t[0] = a, t[1] = b, t[2] = c;
}

/* X of a sheet or disc in the x-z plane. */
static void clothi_flat_pattern(cloth_mesh *m) {
    int i;
    for (i = 0; i < 3 * m->nf; i++) {
        m->X[2 * (size_t)i] = m->x[3 * m->faces[i]];
        m->X[2 * (size_t)i + 1] = -m->x[3 * m->faces[i] + 2];
    }
}

static void clothi_sheet_points(cloth_mesh *m, int nx, int ny, double width, double height,
                                int shifted) {
    double *p = m->x;
    int     i, j;
    for (j = 0; j < ny; j++) {
        const int odd = shifted && j % 2;
        for (i = 0; i < nx + odd; i++, p += 3) {
            p[0] = odd ? width * (i == 0 ? 0.0 : i == nx ? 1.0 : (i - 0.5) / (nx - 1))
                       : width * i / (nx - 1);
            p[2] = height * j / (ny - 1);
        }
    }
}

static void clothi_sheet_grid(cloth_mesh *m, int nx, int ny, int alternating) {
    int i, j, f = 0;
    for (j = 0; j < ny - 1; j++)
        for (i = 0; i < nx - 1; i++) {
            const int a = j * nx + i, b = a + 1, c = a + nx, d = c + 1;
            const int turned = alternating && (i + j) % 2 == 1;
            clothi_add_face(m, &f, a, turned ? c : d, b);
            clothi_add_face(m, &f, turned ? b : a, c, d);
        }
}

static void clothi_sheet_shifted(cloth_mesh *m, int nx, int ny) {
    int i, j, f = 0;
    for (j = 0; j < ny - 1; j++) {          /* row j begins at j nx + j/2                      */
        const int odd = j % 2, above = j + !odd, below = j + odd;
        for (i = 0; i < nx; i++) {          /* base on the odd row, tip on the even one        */
            const int a = above * nx + above / 2 + i, tip = below * nx + below / 2 + i;
            clothi_add_face(m, &f, a, odd ? tip : a + 1, odd ? a + 1 : tip);
            if (i == nx - 1) continue;      /* base on the even row, tip on the odd one        */
            clothi_add_face(m, &f, tip, odd ? tip + 1 : a + 1, odd ? a + 1 : tip + 1);
        }
    }
}

CLOTH_API cloth_status cloth_mesh_sheet(const cloth_hooks *hooks, cloth_sheet_pattern pattern,
                                        int nx, int ny, double width, double height,
                                        cloth_mesh **out) {
    const int    shifted = pattern == CLOTH_SHEET_EQUILATERAL;
    clothi_given given[4] = {
        {"width", width, 0, 0}, {"height", height, 0, 0}, {"nx", 0, nx, 2}, {"ny", 0, ny, 2}};
    cloth_status status;
    if (out) *out = NULL;
    if (!shifted && pattern != CLOTH_SHEET_ALTERNATING && pattern != CLOTH_SHEET_DIAGONAL)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "pattern = %i is none of CLOTH_SHEET_",
                           (int)pattern);
    if (shifted && ny == 0) {
        const double rows = height / width * (nx - 1.0) / sqrt(0.75);
        ny = rows < 1.5 ? 2 : rows < CLOTH_MAX_COUNT ? (int)(rows + 0.5) + 1 : CLOTH_MAX_COUNT;
        given[3].n = ny;
    }
    status = clothi_generate(hooks, "cloth_mesh_sheet: out", given, 4,
                             (double)nx * ny + (shifted ? ny / 2 : 0),
                             (ny - 1.0) * (shifted ? 2.0 * nx - 1 : 2.0 * (nx - 1.0)), 1, out);
    if (status) return status;
    clothi_sheet_points(*out, nx, ny, width, height, shifted);
    if (shifted) clothi_sheet_shifted(*out, nx, ny);
    else clothi_sheet_grid(*out, nx, ny, pattern == CLOTH_SHEET_ALTERNATING);
    clothi_flat_pattern(*out);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_mesh_tube(const cloth_hooks *hooks, double radius, double height,
                                       int around, int along, cloth_mesh **out) {
    static const int   corner[6][2] = {{0, 0}, {2, 0}, {1, 1}, {2, 0}, {3, 1}, {1, 1}};
    const clothi_given given[4] = {{"radius", radius, 0, 0}, {"height", height, 0, 0},
                                   {"around", 0, around, 3}, {"along", 0, along, 2}};
    double             base, rise, bulge, side, c, s;
    int                i, j, k, at = 0;
    cloth_status       status = clothi_generate(hooks, "cloth_mesh_tube: out", given, 4,
                                                (double)around * along,
                                                2.0 * around * (along - 1.0), 1, out);
    if (status) return status;
    for (j = 0; j < along; j++)
        for (i = 0; i < around; i++) {
            double *p = (*out)->x + 3 * (j * around + i);
            clothi_circle((i + 0.5 * (j % 2)) / around, &c, &s);
            p[0] = radius * c;
            p[1] = height * j / (along - 1);
            p[2] = -radius * s;
        }
    clothi_circle(0.5 / around, &c, &s);
    base = 2 * radius * s;
    clothi_circle(0.25 / around, &c, &s);
    bulge = 2 * radius * s * s, side = height / (along - 1);
    rise = side * sqrt(1 + bulge / side * (bulge / side));
    for (j = 0; j < along - 1; j++)
        for (i = 0; i < around; i++)
            for (k = 0; k < 6; k++, at++) { /* two faces: half steps around, and the row       */
                const int half = 2 * i + j % 2 + corner[k][0], row = j + corner[k][1];
                (*out)->faces[at] = row * around + (half - row % 2) / 2 % around;
                (*out)->X[2 * (size_t)at] = 0.5 * base * half;
                (*out)->X[2 * (size_t)at + 1] = rise * row;
            }
    return CLOTH_OK;
}

/* Vertex i of ring k of a disc, i taken around. */
static int clothi_ring_vertex(int k, int i) {
    return k == 0 ? 0 : 1 + 3 * k * (k - 1) + i % (6 * k);
}

CLOTH_API cloth_status cloth_mesh_disc(const cloth_hooks *hooks, double radius, int rings,
                                       cloth_mesh **out) {
    const clothi_given given[2] = {{"radius", radius, 0, 0}, {"rings", 0, rings, 1}};
    int                i, k, s, f = 0;
    cloth_status       status = clothi_generate(hooks, "cloth_mesh_disc: out", given, 2,
                                                1 + 3.0 * rings * (rings + 1.0),
                                                6.0 * rings * rings, 1, out);
    if (status) return status;
    for (k = 1; k <= rings; k++)
        for (i = 0; i < 6 * k; i++) {
            const double r = radius * k / rings;
            double      *p = (*out)->x + 3 * clothi_ring_vertex(k, i), c, d;
            clothi_circle(i / (6.0 * k), &c, &d);
            p[0] = r * c;
            p[2] = -r * d;
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

/* Counts, arrays and indices of a mesh: meshes[at] of cloth_mesh_merge, or at = -1: the mesh of
 * cloth_obj_format, which asks for no render_vertex. */
static cloth_status clothi_mesh_arrays(const cloth_hooks *hooks, const cloth_mesh *m, int at) {
    const int nr = m->nr, corners = nr > 0 ? m->nf : 0;
    const struct { const char *name; int n, most; } count[4] = {
        {"nv", m->nv, CLOTH_MAX_COUNT}, {"nf", m->nf, CLOTH_MAX_COUNT},
        {"nr", nr, 3 * CLOTH_MAX_COUNT}, {"npart", m->part ? m->npart : 0, CLOTH_MAX_COUNT}};
    const struct { const char *name; const int *a; int n, width, end; } index[4] = {
        {"faces", m->faces, m->nf, 3, m->nv}, {"part", m->part, m->part ? m->nf : 0, 1, m->npart},
        {"render_vertex", m->render_vertex, at < 0 ? 0 : nr, 1, m->nv},
        {"render_faces", m->render_faces, corners, 3, nr}};
    const char  *missing = m->nv > 0 && !m->x ? "x" : nr > 0 && !m->vt ? "vt" : NULL;
    char         name[32];
    const char  *who = clothi_member(name, "meshes", at);
    cloth_status status = CLOTH_OK;
    int          k;
    for (k = 0; k < 4 && !status; k++)
        status = clothi_check_count(hooks, who, count[k].name, count[k].n, 0, count[k].most);
    for (k = 0; k < 4 && !status && !missing; k++) {
        if (index[k].n > 0 && !index[k].a) missing = index[k].name;
        else status = clothi_check_indices(hooks, CLOTH_ERR_ARGUMENT, who, index[k].name,
                                           index[k].a, index[k].n, index[k].width, index[k].end);
    }
    if (status || !missing) return status;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s%s is NULL", who, missing);
}

/* What `a`, meshes[which], adds to `m` behind the vertices, faces, parts and render corners that
 * the counts in `at` say are there, and to them. */
static cloth_status clothi_mesh_append(const cloth_hooks *hooks, cloth_mesh *m,
                                       const cloth_mesh *a, int which, cloth_mesh *at) {
    const int *rf = a->nr > 0 ? a->render_faces : a->faces;
    const int  nr = a->nr > 0 ? a->nr : a->nv;
    int        i;
    if (a->x) memcpy(m->x + 3 * at->nv, a->x, 3 * sizeof(double) * (size_t)a->nv);
    for (i = 0; i < 3 * a->nf; i++) m->faces[3 * at->nf + i] = at->nv + a->faces[i];
    for (i = 0; i < a->nf; i++) m->part[at->nf + i] = at->npart + (a->part ? a->part[i] : 0);
    if (m->X && a->X)
        memcpy(m->X + 6 * (size_t)at->nf, a->X, 6 * sizeof(double) * (size_t)a->nf);
    else if (m->X) {
        cloth_status status = cloth_flatten(a->nv, a->x, a->nf, a->faces,
                                            m->X + 6 * (size_t)at->nf);
        if (status != CLOTH_OK)
            return clothi_fail(hooks, status, "meshes[%i].X is NULL, and it cannot be laid flat: "
                               "cloth_mesh_check says where", which);
    }
    for (i = 0; m->nr > 0 && i < 3 * a->nf; i++)
        m->render_faces[3 * at->nf + i] = at->nr + rf[i];
    for (i = 0; m->nr > 0 && i < nr; i++)
        m->render_vertex[at->nr + i] = at->nv + (a->nr > 0 ? a->render_vertex[i] : i);
    if (a->nr > 0) memcpy(m->vt + 2 * at->nr, a->vt, 2 * sizeof(double) * (size_t)nr);
    at->nv += a->nv, at->nf += a->nf, at->npart += a->part ? a->npart : 1, at->nr += nr;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_mesh_merge(const cloth_hooks *hooks, cloth_mesh *const *meshes,
                                        int count, cloth_mesh **out) {
    double       nv = 0, nf = 0, npart = 0, nr = 0;
    int          i, with_X = 0, with_render = 0;
    cloth_mesh   at;
    cloth_status status = CLOTH_OK;
    if (!out) return clothi_null(hooks, "cloth_mesh_merge: out");
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
    for (i = 0; i < count && !status; i++) status = clothi_mesh_arrays(hooks, meshes[i], i);
    if (status) return status;
    *out = clothi_mesh_alloc(hooks, (int)nv, (int)nf, with_X, (int)npart,
                             with_render ? (int)nr : 0, 0);
    if (!*out) return CLOTH_ERR_MEMORY;
    memset(&at, 0, sizeof at);
    for (i = 0; i < count && !status; i++)
        status = clothi_mesh_append(hooks, *out, meshes[i], i, &at);
    if (status) {
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
 * Why those numbers. With e = x1 - x0 and a = x2 - x0 the edges ask for
 *     l = |e|,     p^2 + q^2 = |a|^2,     (p - l)^2 + q^2 = |a - e|^2.
 * The second less the third: 2 l p = |a|^2 + l^2 - |a - e|^2 = 2 e.a + l^2 - l^2, so p = e.a/l.
 * Then q^2 = |a|^2 - (e.a)^2/l^2 = |e x a|^2/l^2 (Lagrange's identity), so q = |e x a|/l. The
 * cross product keeps its digits where |a|^2 - p^2, a difference of near equals, loses half of
 * them. The area is l q/2 = |e x a|/2: that of the triangle in space. Nothing is lost.
 *
 * Two sweeps, the first of which only looks: X is written when all can be written.
 * checked: tests/test_rest.c */

CLOTH_API cloth_status cloth_flatten(int nv, const double *x, int nf, const int *faces, double *X) {
    clothi_triangle t;
    int             f, write;
    if (clothi_check_counts(NULL, nv, nf) != CLOTH_OK) return CLOTH_ERR_ARGUMENT;
    if ((nv > 0 && !x) || (nf > 0 && (!faces || !X))) return CLOTH_ERR_ARGUMENT;
    if (clothi_find_nonfinite(x, 3 * (size_t)nv) >= 0) return CLOTH_ERR_NONFINITE;
    if (clothi_check_faces(NULL, nv, nf, faces) != CLOTH_OK) return CLOTH_ERR_MESH;
    for (write = 0; write < 2; write++) {
        for (f = 0; f < nf; f++) {
            const int *v = faces + 3 * f;
            double    *P = X + 6 * (size_t)f;
            if (!clothi_triangle_shape(x + 3 * v[0], x + 3 * v[1], x + 3 * v[2], &t))
                return CLOTH_ERR_MESH;
            if (!write) continue;
            P[0] = P[1] = P[3] = 0;
            P[2] = t.l, P[4] = t.p, P[5] = t.q;
        }
    }
    return CLOTH_OK;
}

/* ===== [4.5] OBJ FILES =========================================================================
 *
 *   text --- lines, tokens ---> statements --- twice ---> counts, then arrays ---> cloth_mesh
 *   decimal digits  <--- doubled, halved --->  double
 *
 * Numbers. libc's strtod and printf follow the locale (a German one reads 0,5), so the two
 * conversions are our own. Both are exact arithmetic on decimal digits.
 *   Reading: the decimal digits are doubled or halved until the integer part has 60 to 64 bits,
 *   which loses nothing: a half is 5 tenths.
 *   One rounding, half to even, also for subnormals. 800 digits decide every case (a midpoint
 *   between doubles has at most 768); what follows them only counts as 'not zero'.
 *   Writing: all digits of v, found likewise, are rounded to 15 of them, to 16 and 17, until they
 *   read back as v; 17 always do [SW90]. 15 always come back from a double: a number that has
 *   fewer shows zeros behind them. (Beside a power of two 16 others may do where those of v fail.)
 * Reading runs over the text twice, first to count: one allocation of the right size, and an
 * index is checked where it stands, so that the sentence can name its line.
 * Render corners: distinct (vertex, vt) pairs by two counting sorts of the corners.
 * checked: tests/test_obj.c, tests/fuzz_mesh.c */

/* A number as decimal digits in fixed point, nine to a word: the point stands before w[POINT].
 * Reading meets 10^309 .. 10^-1458 (801 digits from 10^309 on, divided by 2^966), writing 2^1024 ..
 * 2^-1074. Words before first and from end on count as 0. */
#define CLOTHI_FIXED_POINT 35
#define CLOTHI_FIXED_WORDS 200

typedef struct clothi_fixed {
    int      first, end;
    uint32_t w[CLOTHI_FIXED_WORDS];
} clothi_fixed;

static uint32_t clothi_fixed_word(const clothi_fixed *a, int i) {
    return i >= a->first && i < a->end ? a->w[i] : 0u;
}

/* a > 0 times 2^e, exactly; afterwards its last word is not 0. */
static void clothi_fixed_scale(clothi_fixed *a, int e) {
    const uint64_t base = 1000000000u;
    uint64_t       carry;
    int            i, bits;
    for (; e > 0; e -= bits) {
        bits = e < 32 ? e : 32;
        for (carry = 0, i = a->end - 1; i >= a->first || carry; i--, carry /= base) {
            carry += (uint64_t)clothi_fixed_word(a, i) << bits;
            a->w[i] = (uint32_t)(carry % base);
        }
        a->first = i + 1;
    }
    for (; e < 0; e += bits) {
        bits = e > -32 ? -e : 32;
        for (carry = 0, i = a->first; i < a->end || carry; i++) {
            carry = carry * base + clothi_fixed_word(a, i);
            a->w[i] = (uint32_t)(carry >> bits);
            carry &= ((uint64_t)1 << bits) - 1u;
        }
        a->end = i;
        while (a->w[a->first] == 0) a->first++;
    }
    while (a->w[a->end - 1] == 0) a->end--;
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
    for (; s < end && (clothi_is_digit(*s) || (*s == '.' && !after_point)); s++) {
        if (*s == '.') {
            after_point = 1;
            continue;
        }
        any = 1;
        d->point += !after_point;
        if (d->n == 0 && *s == '0') d->point--;
        else if (d->n < CLOTHI_DIGITS) d->d[d->n++] = (unsigned char)(*s - '0');
        else more |= *s != '0';
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

/* The double nearest to q 2^(lead-63), plus less than one unit of q when more != 0; q has 64 bits.
 * Rounded by hand to the bits that the double has, so that ldexp has nothing to round. */
static double clothi_round_to_double(uint64_t q, int lead, int more) {
    const int      drop = lead >= -1022 ? 11 : -1011 - lead;        /* bits of q; 65: beyond all */
    const uint64_t half = (uint64_t)1 << 63, rest = drop <= 64 ? q << (64 - drop) : 0;
    uint64_t       out = drop <= 64 ? q >> (drop - 1) >> 1 : 0;
    out += rest > half || (rest == half && (more || (out & 1u)));
    return ldexp((double)out, lead - 63 + drop);
}

/* The nearest double, without the sign; infinite when too large. */
static double clothi_decimal_value(const clothi_decimal *d) {
    int          i, g, lead;                /* g: a digit's place                            */
    uint64_t     q = 0;
    clothi_fixed a;
    if (d->n == 0 || d->point < -330) return 0;
    if (d->point > 310) return HUGE_VAL;
    lead = (int)floor((double)d->point * 3.3219280948873623);   /* or 1 to 4 less */
    g = 9 * CLOTHI_FIXED_POINT - (int)d->point;
    a.first = g / 9;
    a.w[a.first] = 0;
    for (i = 0; i < d->n || g % 9; i++, g++)
        a.w[g / 9] = (g % 9 ? 10u * a.w[g / 9] : 0u) + (i < d->n ? d->d[i] : 0u);
    a.end = g / 9;
    clothi_fixed_scale(&a, 63 - lead);
    for (i = 3; i > 0; i--) q = q * 1000000000u + clothi_fixed_word(&a, CLOTHI_FIXED_POINT - i);
    for (i = 0; q >> 63 == 0; i++) q <<= 1;
    return clothi_round_to_double(q, lead - i, a.end > CLOTHI_FIXED_POINT);
}

/* 1 and the nearest double when the n bytes are a decimal number. */
static int clothi_parse_double(const char *s, size_t n, double *out) {
    clothi_decimal d;
    if (!clothi_decimal_scan(s, n, &d)) return 0;
    *out = d.negative ? -clothi_decimal_value(&d) : clothi_decimal_value(&d);
    return 1;
}

/* --- writing a number --- */

/* All digits of a > 0, finite. Returns how many always survive a: from them to it and back. */
static int clothi_decimal_of(double a, clothi_decimal *d) {
    int          e, i, bits;
    uint64_t     u = (uint64_t)ldexp(frexp(a, &e), 53);             /* a = u 2^(e-53) */
    uint32_t     unit;
    clothi_fixed w;
    w.end = CLOTHI_FIXED_POINT, w.first = w.end - 2;
    w.w[w.first] = (uint32_t)(u / 1000000000u), w.w[w.first + 1] = (uint32_t)(u % 1000000000u);
    clothi_fixed_scale(&w, e - 53);
    d->n = 0, d->point = 9 * (CLOTHI_FIXED_POINT - w.first);
    for (i = w.first; i < w.end; i++)
        for (unit = 100000000; unit > 0; unit /= 10) {
            d->d[d->n] = (unsigned char)(w.w[i] / unit % 10u);
            if (d->n > 0 || d->d[0] > 0) d->n++;
            else d->point--;
        }
    while (d->d[d->n - 1] == 0) d->n--;
    bits = e < -1021 ? e + 1073 : 52;       /* of a, but for the first one                     */
    return (int)(0.3010299956639812 * bits);
}

/* out = a rounded to `most` > 0 digits, a tie to even; no 0 at its end. */
static void clothi_decimal_round(const clothi_decimal *a, int most, clothi_decimal *out) {
    int n = a->n < most ? a->n : most;
    int up = n < a->n && (a->d[n] > 5 || (a->d[n] == 5 && (n + 1 < a->n || a->d[n - 1] % 2)));
    memcpy(out->d, a->d, (size_t)n);
    out->point = a->point;
    if (up)
        while (n > 0 && ++out->d[n - 1] > 9) n--;
    if (n == 0) out->d[n++] = 1, out->point++;
    while (out->d[n - 1] == 0) n--;
    out->n = n;
}

/* Rounded to the fewest digits that read back, or to `digits`: plain where 0.d0 d1 .. has its point
 * moved by least .. most, else d0.d1..e-7. */
static void clothi_sink_number(clothi_sink *t, double a, int digits, int least, int most) {
    clothi_decimal all, d;
    int            n, plain, point, i;
    if (!clothi_finite(a)) {
        clothi_sink_string(t, a != a ? "NaN" : a > 0 ? "inf" : "-inf");
        return;
    }
    if (copysign(1, a) < 0) clothi_sink_char(t, '-');
    a = fabs(a);
    if (!(a > 0)) {
        clothi_sink_char(t, '0');
        return;
    }
    n = clothi_decimal_of(a, &all);         /* a number of fewer digits has zeros behind them  */
    n = n < 1 ? 1 : n;
    do clothi_decimal_round(&all, n < digits ? n : digits, &d);
    while (n++ < digits && clothi_decimal_value(&d) != a);
    plain = d.point >= least && d.point <= most, point = plain ? (int)d.point : 1;
    if (point <= 0) clothi_sink_string(t, "0.");
    for (i = point; i < 0; i++) clothi_sink_char(t, '0');
    for (i = 0; i < d.n || i < point; i++) {
        if (i > 0 && i == point) clothi_sink_char(t, '.');
        clothi_sink_char(t, (char)('0' + (i < d.n ? d.d[i] : 0)));
    }
    if (plain) return;
    clothi_sink_char(t, 'e');
    clothi_sink_int(t, d.point - 1);
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
    size_t  line;           /* of p, from 1                                                    */
    int     nv, nvt, nf, nname;                     /* totals, from the first run              */
    int     v, t, f;                                /* so far, in the second run               */
    double *x;              /* [nv x 3]                                                        */
    double *vt;             /* [nvt x 2]                                                       */
    int    *faces;          /* [nf x 3]                                                        */
    int    *corner_vt;      /* [nf x 3] vt + 1, 0: none                                        */
    int    *part;           /* [nf]                                                            */
    clothi_obj_name *names; /* [nname + 1] of the parts                                        */
    int    *table;          /* [table_size] open hash: part + 1, 0 empty                       */
    size_t  table_size;
    int    *order;          /* [6 nf + nkey + 1] where nvt > 0: corners by vertex and vt; scratch */
    int     nkey;
    clothi_obj_name name;   /* in force                                                        */
    int     npart, current; /* parts so far; part of `name`, -1: not yet looked up             */
    char    quote[32];      /* of a sentence                                                   */
} clothi_obj;

#define CLOTHI_OBJ_FAIL(o, format, ...)                                                          \
    clothi_fail((o)->hooks, CLOTH_ERR_PARSE, "line %z: " format, (o)->line, __VA_ARGS__)

CLOTH_API cloth_obj_options cloth_obj_options_default(void) {
    cloth_obj_options o;
    memset(&o, 0, sizeof o);
    o.cookie = CLOTHI_OBJ_COOKIE, o.scale = 1.0, o.parts = CLOTH_OBJ_PARTS_NONE;
    return o;
}

/* Bytes of the line end at p: 0, 1 or 2. */
static int clothi_obj_eol(const clothi_obj *o, const char *p) {
    if (p == o->end) return 0;
    if (*p == '\r') return p + 1 < o->end && p[1] == '\n' ? 2 : 1;
    return *p == '\n';
}

/* What stands between tokens at p, in bytes: a blank 1, a backslash and a line end 2 or 3; 0: it is
 * a token's; -1: nothing more is said on this line. */
static int clothi_obj_gap(const clothi_obj *o, const char *p) {
    if (p == o->end || *p == '#' || clothi_obj_eol(o, p)) return -1;
    if (*p == '\\' && clothi_obj_eol(o, p + 1)) return 1 + clothi_obj_eol(o, p + 1);
    return *p == ' ' || *p == '\t' || *p == '\v' || *p == '\f';
}

/* The next token of this line; 0 at its end or at a comment. */
static int clothi_obj_token(clothi_obj *o, clothi_obj_name *token) {
    int n;
    for (; (n = clothi_obj_gap(o, o->p)) > 0; o->p += n) o->line += n > 1;
    for (token->s = o->p; n == 0; n = clothi_obj_gap(o, o->p)) o->p++;
    token->n = (size_t)(o->p - token->s);
    return token->n > 0;
}

static void clothi_obj_skip_line(clothi_obj *o) {
    clothi_obj_name token;
    int             n = 0;
    while (clothi_obj_token(o, &token)) {}
    while (o->p < o->end && (n = clothi_obj_eol(o, o->p)) == 0) o->p++;     /* a comment */
    o->p += n;
    o->line += n > 0;
}

/* A piece of the text for a sentence: at most 31 bytes, printable. */
static const char *clothi_obj_quote(clothi_obj *o, const clothi_obj_name *token) {
    size_t i;
    for (i = 0; i < 31 && i < token->n; i++)
        o->quote[i] = token->s[i] >= ' ' && token->s[i] <= '~' ? token->s[i] : '?';
    o->quote[i] = '\0';
    return o->quote;
}

/* Up to n numbers of this line into out, of which `least` must be there. */
static cloth_status clothi_obj_numbers(clothi_obj *o, const char *keyword, int n, int least,
                                       double *out) {
    int i, number;
    for (i = 0; i < n; i++) {
        clothi_obj_name token;
        if (!clothi_obj_token(o, &token)) {
            if (i >= least) return CLOTH_OK;
            return CLOTHI_OBJ_FAIL(o, "%s has %i numbers but needs %i", keyword, i, least);
        }
        number = clothi_parse_double(token.s, token.n, out + i);
        if (!number || !clothi_finite(out[i]))
            return CLOTHI_OBJ_FAIL(o, "%s: '%s' is %s", keyword, clothi_obj_quote(o, &token),
                                   number ? "too large" : "not a number");
    }
    return CLOTH_OK;
}

static cloth_status clothi_obj_vertex(clothi_obj *o) {
    double      *p = o->x + 3 * o->v;
    int          k;
    cloth_status status = clothi_obj_numbers(o, "v", 3, 3, p);
    if (status != CLOTH_OK) return status;
    for (k = 0; k < 3; k++) p[k] *= o->opt.scale;
    if (clothi_find_nonfinite(p, 3) >= 0)
        return CLOTHI_OBJ_FAIL(o, "v times scale %g is too large", o->opt.scale);
    o->v++;
    return CLOTH_OK;
}

static cloth_status clothi_obj_texture(clothi_obj *o) {
    const double scale = o->opt.pattern_scale;
    double      *p = o->vt + 2 * o->t++;
    cloth_status status;
    p[1] = 0;
    status = clothi_obj_numbers(o, "vt", 2, 1, p);
    if (status || (clothi_finite(scale * p[0]) && clothi_finite(scale * p[1]))) return status;
    return CLOTHI_OBJ_FAIL(o, "vt times pattern_scale %g is too large", scale);
}

/* An index of a corner at s, *out = 0: none. Returns where it ends. */
static const char *clothi_obj_index(const char *s, const char *end, long long *out) {
    const char *first;
    int         minus = 0;
    if (end - s > 1 && (*s == '+' || *s == '-') && clothi_is_digit(s[1])) minus = *s++ == '-';
    for (*out = 0, first = s; s < end && clothi_is_digit(*s); s++)
        if (*out < 1000000000000) *out = 10 * *out + (*s - '0');
    if (s > first && *out == 0) *out = 1000000000000;   /* index 0 is out of range, not none   */
    if (minus) *out = -*out;
    return s;
}

/* v, v/vt, v//vn or v/vt/vn; any of vt and vn may be empty. Indices from 1, or from the last one
 * so far. corner [2]: vertex and vt from 0, -1: none */
static cloth_status clothi_obj_corner(clothi_obj *o, const clothi_obj_name *token, int *corner) {
    const char *s = token->s, *end = s + token->n;
    long long   index[3] = {0, 0, 0};
    int         n = 0;
    do s = clothi_obj_index(s + (n > 0), end, &index[n]);
    while (++n < 3 && s < end && *s == '/');
    if (s != end || index[0] == 0)
        return CLOTHI_OBJ_FAIL(o, "'%s' is not a face corner v/vt/vn", clothi_obj_quote(o, token));
    for (n = 0; n < 2; n++) {
        const int       so_far = n ? o->t : o->v, total = n ? o->nvt : o->nv;
        const long long i = index[n] < 0 ? so_far + index[n] : index[n] - 1;
        corner[n] = i >= 0 && i < total ? (int)i : -1;
        if (corner[n] < 0 && index[n])
            return CLOTHI_OBJ_FAIL(o, "'%s': no such %s; %i of %i have been given",
                                   clothi_obj_quote(o, token), n ? "vt" : "vertex", so_far, total);
    }
    if (index[1] || !(o->opt.pattern_scale > 0)) return CLOTH_OK;
    return CLOTHI_OBJ_FAIL(o, "'%s' has no vt, but pattern_scale = %g asks for a pattern",
                           clothi_obj_quote(o, token), o->opt.pattern_scale);
}

/* The part of the name in force; a new one gets the next number. */
static int clothi_obj_find_part(clothi_obj *o) {
    const uint64_t hash = clothi_hash(0xcbf29ce484222325u, o->name.s, o->name.n);
    size_t         i;
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
    int             c[3][2] = {{0}}, n, k;  /* corners: the first, the last, this one          */
    clothi_obj_name token;
    for (n = 0; clothi_obj_token(o, &token); n++) {
        cloth_status status = clothi_obj_corner(o, &token, c[n < 2 ? n : 2]);
        if (status != CLOTH_OK) return status;
        if (n < 2) continue;
        for (k = 0; k < 3; k++) {
            o->faces[3 * o->f + k] = c[k][0];
            o->corner_vt[3 * o->f + k] = c[k][1] + 1;
        }
        if (o->current < 0) o->current = clothi_obj_find_part(o);
        o->part[o->f++] = o->current;
        memcpy(c[1], c[2], sizeof c[1]);
    }
    return n < 3 ? CLOTHI_OBJ_FAIL(o, "f has %i corners but needs 3", n) : CLOTH_OK;
}

/* The rest of the line, blanks at its ends left out, is the name of the faces that follow; up to a
 * \ that goes on, or a byte 0, which ends it in cloth_mesh.names too. */
static cloth_status clothi_obj_set_name(clothi_obj *o) {
    clothi_obj_name token;
    size_t          line, n = 0;
    o->current = -1;
    o->name.n = 0;
    if (!clothi_obj_token(o, &token)) return CLOTH_OK;
    o->name.s = token.s, line = o->line;
    do n = (size_t)(token.s + token.n - o->name.s);
    while (clothi_obj_token(o, &token) && o->line == line);
    while (o->name.n < n && o->name.s[o->name.n]) o->name.n++;
    return CLOTH_OK;
}

/* The statements that count, towards which total, and what reads them; of the last three, which
 * stand in the order of cloth_obj_parts, the one that names parts. */
static const struct {
    const char  *word;
    size_t       total;
    cloth_status (*read)(clothi_obj *o);
} clothi_obj_statements[] = {{"v", offsetof(clothi_obj, nv), clothi_obj_vertex},
                             {"vt", offsetof(clothi_obj, nvt), clothi_obj_texture},
                             {"f", offsetof(clothi_obj, nf), clothi_obj_face},
                             {"o", offsetof(clothi_obj, nname), clothi_obj_set_name},
                             {"g", offsetof(clothi_obj, nname), clothi_obj_set_name},
                             {"usemtl", offsetof(clothi_obj, nname), clothi_obj_set_name}};

/* Statement k counts in the first run; the triangles of a face. */
static cloth_status clothi_obj_count(clothi_obj *o, int k) {
    int            *total = (int *)(void *)((char *)o + clothi_obj_statements[k].total), n = 0;
    clothi_obj_name token;
    if (k != 2) ++*total;
    while (k == 2 && *total <= CLOTH_MAX_COUNT && clothi_obj_token(o, &token)) *total += ++n >= 3;
    if (*total <= CLOTH_MAX_COUNT - (k > 2)) return CLOTH_OK;
    return clothi_fail(o->hooks, CLOTH_ERR_CAPACITY, "line %z: more than %i of a kind", o->line,
                       CLOTH_MAX_COUNT);
}

/* A run over the text: the first one, without arrays yet, only counts. */
static cloth_status clothi_obj_run(clothi_obj *o, const char *text, size_t size) {
    cloth_status status = CLOTH_OK;
    o->p = text, o->end = text + size, o->line = 1;
    if (size >= 3 && memcmp(text, "\xef\xbb\xbf", 3) == 0) o->p += 3;        /* byte order mark */
    for (; o->p < o->end && status == CLOTH_OK; clothi_obj_skip_line(o)) {
        clothi_obj_name keyword;
        int             k = 0;
        if (!clothi_obj_token(o, &keyword)) continue;
        while (k < 6 && (keyword.n != strlen(clothi_obj_statements[k].word) ||
                         memcmp(keyword.s, clothi_obj_statements[k].word, keyword.n) != 0))
            k++;
        if (k == 6 || (k > 2 && k - 2 != (int)o->opt.parts)) continue;
        status = o->x ? clothi_obj_statements[k].read(o) : clothi_obj_count(o, k);
    }
    return status;
}

/* Arrays for the second run. */
static cloth_status clothi_obj_alloc(clothi_obj *o) {
    const size_t t = (size_t)o->nvt, f = (size_t)o->nf, one = sizeof(int), real = sizeof(double);
    const size_t key = (size_t)(o->nv > o->nvt ? o->nv : o->nvt) + 1;
    const size_t table = 2 * (size_t)o->nname + 3;
    const clothi_array need[] = {
        {&o->x, 3 * (size_t)o->nv, real}, {&o->vt, 2 * t, real}, {&o->faces, 3 * f, one},
        {&o->corner_vt, 3 * f, one}, {&o->part, f, one}, {&o->table, table, one},
        {&o->order, t ? 6 * f + key + 1 : 0, one},
        {&o->names, (size_t)o->nname + 1, sizeof *o->names}};
    o->nkey = (int)key, o->table_size = table;
    return clothi_arrays(o->hooks, need, sizeof need / sizeof *need);
}

/* Render corners of a mesh from `order`. mesh NULL: only counts. */
static int clothi_obj_render(const clothi_obj *o, cloth_mesh *mesh) {
    int i, nr = 0, last = 0;
    for (i = 0; i < 3 * o->nf; i++) {
        const int c = o->order[i], v = o->faces[c], t = o->corner_vt[c];
        if (i == 0 || v != o->faces[last] || t != o->corner_vt[last]) {
            if (mesh) mesh->render_vertex[nr] = v;
            if (mesh && t) memcpy(mesh->vt + 2 * nr, o->vt + 2 * (t - 1), 2 * sizeof(double));
            nr++, last = c;
        }
        if (mesh) mesh->render_faces[c] = nr - 1;
    }
    return nr;
}

static cloth_status clothi_obj_finish(clothi_obj *o, cloth_mesh **out) {
    const int   n = 3 * o->nf, with_X = o->opt.pattern_scale > 0;
    int         i, nr = 0;
    char       *name;
    size_t      text = 0;
    cloth_mesh *m;
    if (o->nvt > 0) {
        int *work = o->order + n;
        clothi_sort_by(n, o->nkey, o->corner_vt, NULL, work, work + n);
        clothi_sort_by(n, o->nkey, o->faces, work, o->order, work + n);
        nr = clothi_obj_render(o, NULL);
    }
    for (i = 0; o->opt.parts && i < o->npart; i++) text += o->names[i].n + 1;
    m = clothi_mesh_alloc(o->hooks, o->nv, o->nf, with_X, o->opt.parts ? o->npart : 0, nr, text);
    if (!m) return CLOTH_ERR_MEMORY;
    memcpy(m->x, o->x, 3 * sizeof(double) * (size_t)o->nv);
    memcpy(m->faces, o->faces, sizeof(int) * (size_t)n);
    if (m->part) memcpy(m->part, o->part, sizeof(int) * (size_t)o->nf);
    for (i = 0, name = (char *)m->names; m->part && i < o->npart; name += o->names[i++].n + 1) {
        if (o->names[i].n) memcpy(name, o->names[i].s, o->names[i].n);
        name[o->names[i].n] = 0;
    }
    if (nr > 0) clothi_obj_render(o, m);
    for (i = 0; with_X && i < 2 * n; i++)
        m->X[i] = o->opt.pattern_scale * o->vt[2 * (o->corner_vt[i / 2] - 1) + i % 2];
    *out = m;
    return CLOTH_OK;
}

static cloth_status clothi_obj_check_options(const cloth_hooks *hooks, const cloth_obj_options *o) {
    if (o->cookie != CLOTHI_OBJ_COOKIE)
        return clothi_fail(hooks, CLOTH_ERR_UNINIT, "options are not from "
                           "cloth_obj_options_default()");
    if ((unsigned)o->parts > CLOTH_OBJ_PARTS_MATERIALS)
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
    if (!out) return clothi_null(hooks, "cloth_obj_parse: out");
    *out = NULL;
    if (!text) return clothi_null(hooks, "cloth_obj_parse: text");
    memset(&o, 0, sizeof o);
    o.hooks = hooks;
    o.opt = options ? *options : cloth_obj_options_default();
    o.current = -1;
    status = clothi_obj_check_options(hooks, &o.opt);
    if (!status) status = clothi_obj_run(&o, text, size);
    if (!status && o.nv == 0)
        status = clothi_fail(hooks, CLOTH_ERR_PARSE, "%z lines, %z bytes: no vertex (v)", o.line,
                             size);
    if (!status) status = clothi_obj_alloc(&o);
    if (!status) status = clothi_obj_run(&o, text, size);
    if (!status && o.nf == 0)
        status = clothi_fail(hooks, CLOTH_ERR_PARSE, "%z lines, %i vertices: no face (f)", o.line,
                             o.nv);
    if (!status) status = clothi_obj_finish(&o, out);
    clothi_free(hooks, o.x);
    return status;
}

/* --- writing the text --- */

static void clothi_obj_write_numbers(clothi_sink *s, const char *keyword, const double *a, int n) {
    int k;
    clothi_sink_string(s, keyword);
    for (k = 0; k < n; k++) {
        clothi_sink_char(s, ' ');
        clothi_sink_number(s, a[k], 17, -4, 17);
    }
    clothi_sink_char(s, '\n');
}

/* The pattern as vt: a corner with the same numbers as the last vt of its vertex shares it. Then
 * vt [3 nf] of the corners, last [nv] corner + 1 that the vertex's last vt is from: zeros. */
static void clothi_obj_write(const cloth_mesh *m, int *vt, int *last, clothi_sink *s) {
    const int *corner = vt ? vt : m->nr > 0 ? m->render_faces : NULL;
    int        i, n = 0;
    for (i = 0; i < m->nv; i++) clothi_obj_write_numbers(s, "v", m->x + 3 * i, 3);
    for (i = 0; i < m->nr; i++) clothi_obj_write_numbers(s, "vt", m->vt + 2 * i, 2);
    for (i = 0; vt && i < 3 * m->nf; i++) {
        const double *X = m->X + 2 * (size_t)i;
        int          *j = last + m->faces[i];
        if (*j == 0 || memcmp(m->X + 2 * (size_t)(*j - 1), X, 2 * sizeof *X) != 0) {
            clothi_obj_write_numbers(s, "vt", X, 2);
            *j = i + 1, vt[i] = n++;
        }
        vt[i] = vt[*j - 1];
    }
    for (i = 0; i < 3 * m->nf; i++) {
        if (i % 3 == 0 && m->part && (i == 0 || m->part[i / 3] != m->part[i / 3 - 1])) {
            clothi_sink_string(s, "g part");
            clothi_sink_int(s, m->part[i / 3]);
            clothi_sink_char(s, '\n');
        }
        clothi_sink_string(s, i % 3 ? " " : "f ");
        clothi_sink_int(s, m->faces[i] + 1);
        if (corner) {
            clothi_sink_char(s, '/');
            clothi_sink_int(s, corner[i] + 1);
        }
        if (i % 3 == 2) clothi_sink_char(s, '\n');
    }
}

CLOTH_API cloth_status cloth_obj_format(const cloth_hooks *hooks, const cloth_mesh *mesh,
                                        char *buf, size_t capacity, size_t *needed) {
    clothi_sink  sink = {buf, buf ? capacity : 0, 0};
    cloth_status status;
    int         *vt = NULL;
    if (!mesh) return clothi_null(hooks, "cloth_obj_format: mesh");
    status = clothi_mesh_arrays(hooks, mesh, -1);       /* the caller may have written into it */
    if (status != CLOTH_OK) return status;
    if (clothi_find_nonfinite(mesh->x, 3 * (size_t)mesh->nv) >= 0 ||
        (mesh->nr > 0 && clothi_find_nonfinite(mesh->vt, 2 * (size_t)mesh->nr) >= 0) ||
        (mesh->X && clothi_find_nonfinite(mesh->X, 6 * (size_t)mesh->nf) >= 0))
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "cloth_obj_format: a number of the mesh is "
                           "NaN or infinite: OBJ cannot hold it");
    if (mesh->nr == 0 && mesh->X) {
        vt = (int *)clothi_alloc(hooks, 3 * (size_t)mesh->nf + (size_t)mesh->nv, sizeof(int));
        if (!vt) return CLOTH_ERR_MEMORY;
    }
    clothi_obj_write(mesh, vt, vt ? vt + 3 * mesh->nf : NULL, &sink);
    clothi_free(hooks, vt);
    if (needed) *needed = sink.n;
    if (!buf || sink.n <= capacity) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "the OBJ text has %z bytes but capacity = %z",
                       sink.n, capacity);
}

/* --- files --- */

/* The whole of a file, owned by the caller; pipes too, so its size is found by reading. */
static cloth_status clothi_read_file(const cloth_hooks *hooks, const char *path, char **out,
                                     size_t *size) {
#ifdef CLOTH_NO_STDIO
    (void)out, (void)size;
    return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "%s: built with CLOTH_NO_STDIO", path);
#else
    FILE        *file = fopen(path, "rb");
    char        *buf = NULL;
    size_t       n = 0, capacity = 32768;
    cloth_status status = CLOTH_OK;
    if (!file) return clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be opened", path);
    do {
        char *larger = (char *)clothi_alloc(hooks, capacity *= 2, 1);
        if (!larger) {
            status = CLOTH_ERR_MEMORY;
            break;
        }
        if (n) memcpy(larger, buf, n);
        clothi_free(hooks, buf);
        buf = larger;
        n += fread(buf + n, 1, capacity - n, file);
    } while (n == capacity);
    if (!status && ferror(file))
        status = clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be read", path);
    if (status) clothi_free(hooks, buf);
    else *out = buf, *size = n;
    fclose(file);
    return status;
#endif
}

static cloth_status clothi_write_file(const cloth_hooks *hooks, const char *path, const char *text,
                                      size_t size) {
#ifdef CLOTH_NO_STDIO
    (void)text, (void)size;
    return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "%s: built with CLOTH_NO_STDIO", path);
#else
    FILE *file = fopen(path, "wb");
    int   whole;
    if (!file) return clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be opened for writing", path);
    whole = fwrite(text, 1, size, file) == size;
    if (fclose(file) == 0 && whole) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_IO, "%s: cannot be written", path);
#endif
}

CLOTH_API cloth_status cloth_obj_load(const cloth_hooks *hooks, const char *path,
                                      const cloth_obj_options *options, cloth_mesh **out) {
    char        *text = NULL;
    size_t       size = 0;
    cloth_status status;
    if (!out) return clothi_null(hooks, "cloth_obj_load: out");
    *out = NULL;
    if (!path) return clothi_null(hooks, "cloth_obj_load: path");
    status = clothi_read_file(hooks, path, &text, &size);
    if (status == CLOTH_OK) status = cloth_obj_parse(hooks, text, size, options, out);
    clothi_free(hooks, text);
    return status;
}

CLOTH_API cloth_status cloth_obj_save(const cloth_hooks *hooks, const char *path,
                                      const cloth_mesh *mesh) {
    char        *text;
    size_t       size = 0;
    cloth_status status;
    if (!path) return clothi_null(hooks, "cloth_obj_save: path");
    status = cloth_obj_format(hooks, mesh, NULL, 0, &size);
    if (status != CLOTH_OK) return status;
    text = (char *)clothi_alloc(hooks, size, 1);
    if (!text) return CLOTH_ERR_MEMORY;
    status = cloth_obj_format(hooks, mesh, text, size, NULL);
    if (status == CLOTH_OK) status = clothi_write_file(hooks, path, text, size);
    clothi_free(hooks, text);
    return status;
}

/* ===== [4.6] CLOSED MESHES, WELD, ORIENT =======================================================
 *
 * A ball and a cylinder are rings around the y axis between two poles. Welding looks for a vertex
 * that stays in the 27 cells of side `distance` about each one. Orienting goes from face to face:
 *
 *     a-----b     Two faces agree when they run along their edge in opposite directions: f = abc,
 *     | f / |     g = bdc. A closed piece looks outwards when its volume is positive, the sum over
 *     |  / g|     its faces of det(x0, x1, x2)/6 as seen from one of its vertices.
 *     c-----d
 * checked: tests/test_first.c */

/* Vertex 0 is the pole below, the last one that above; ball: the rings are its parallels. */
static cloth_status clothi_closed(const cloth_hooks *hooks, double radius, double height,
                                  int around, int rings, int ball, cloth_mesh **out) {
    const clothi_given given[3] = {{"radius", radius, 0, 0}, {"height", height, 0, 0},
                                   {"around", 0, around, 3}};
    int          i, k, f = 0, last;
    double      *x;
    cloth_status status = clothi_generate(hooks, "out", given, 3, 2 + (double)rings * around,
                                          2.0 * rings * around, 0, out);
    if (status) return status;
    x = (*out)->x, last = (*out)->nv - 1;
    x[3 * last + 1] = ball ? radius : 0.5 * height, x[1] = -x[3 * last + 1];
    for (k = 0; k < rings; k++)
        for (i = 0; i < around; i++) {
            const int a = 1 + k * around + i, b = 1 + k * around + (i + 1) % around;
            double    c, s, down = 0, flat = 1;
            clothi_circle((double)i / around, &c, &s);
            if (ball) clothi_circle(0.5 * (k + 1) / (rings + 1), &down, &flat);
            x[3 * a] = radius * flat * c;
            x[3 * a + 1] = ball ? -radius * down : height * (k - 0.5);
            x[3 * a + 2] = -radius * flat * s;
            clothi_add_face(*out, &f, a, b, k + 1 < rings ? a + around : last);
            clothi_add_face(*out, &f, b, a, k > 0 ? b - around : 0);
        }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_mesh_ball(const cloth_hooks *hooks, double radius, int around,
                                       cloth_mesh **out) {
    const int rings = (around / 2 - 1) | 1; /* an odd number: one is the equator */
    return clothi_closed(hooks, radius, radius, around, rings, 1, out);
}

CLOTH_API cloth_status cloth_mesh_cylinder(const cloth_hooks *hooks, double radius, double height,
                                           int around, cloth_mesh **out) {
    return clothi_closed(hooks, radius, height, around, 2, 0, out);
}

/* Four around, turned by an eighth: the square between (1, 1) and (-1, -1). */
CLOTH_API cloth_status cloth_mesh_box(const cloth_hooks *hooks, const double size[3],
                                      cloth_mesh **out) {
    static const char *const name[3] = {"size[0]", "size[1]", "size[2]"};
    cloth_status             status;
    int                      i;
    if (out) *out = NULL;
    if (!size) return clothi_null(hooks, "cloth_mesh_box: size");
    for (i = 0; i < 3; i++)
        if (clothi_check_size(hooks, name[i], size[i])) return CLOTH_ERR_ARGUMENT;
    status = clothi_closed(hooks, size[0], size[1], 4, 2, 0, out);
    if (status) return status;
    for (i = 1; i < 9; i++) {
        (*out)->x[3 * i] = (i + 3) % 4 < 2 ? 0.5 * size[0] : -0.5 * size[0];
        (*out)->x[3 * i + 2] = (i + 2) % 4 < 2 ? -0.5 * size[2] : 0.5 * size[2];
    }
    return CLOTH_OK;
}

/* The first vertex that stays within d of p, or -1; *home: the slot of p's own cell. */
static int clothi_weld_find(const double *x, const double *p, double d, const int *head,
                            const int *next, int slots, int *home) {
    double own[3], cell[3];
    int    n, k, w, best = -1;
    for (k = 0; k < 3; k++) own[k] = floor(p[k] / d);
    for (n = 0; n < 27; n++) {
        int step = n, slot;
        for (k = 0; k < 3; k++, step /= 3) cell[k] = own[k] + (step % 3 - 1) + 0.0; /* no -0 */
        slot = (int)((clothi_hash(0, cell, sizeof cell) >> 32) % (unsigned)slots);
        if (n == 13) *home = slot;
        for (w = head[slot] - 1; w >= 0; w = next[w] - 1) {
            double part[3];
            for (k = 0; k < 3; k++) part[k] = (p[k] - x[3 * w + k]) / d;
            if ((best < 0 || w < best) && clothi_dot3(part, part) <= 1) best = w;
        }
    }
    return best;
}

CLOTH_API cloth_status cloth_mesh_weld(const cloth_hooks *hooks, const cloth_mesh *mesh,
                                       double distance, cloth_mesh **out) {
    int         *head, *next, *to, i, k, home = 0;
    cloth_mesh  *m;
    cloth_status status;
    if (!out) return clothi_null(hooks, "cloth_mesh_weld: out");
    *out = NULL;
    if (!mesh) return clothi_null(hooks, "cloth_mesh_weld: mesh");
    status = clothi_check_size(hooks, "distance", distance);
    if (!status) status = clothi_mesh_arrays(hooks, mesh, -1);
    if (!status) status = clothi_check_vector(hooks, "x", mesh->x, 3 * mesh->nv);
    if (status) return status;
    m = clothi_mesh_alloc(hooks, mesh->nv, mesh->nf, mesh->X != NULL, mesh->part ? mesh->npart : 0,
                          0, 0);
    head = (int *)clothi_alloc(hooks, 3 * (size_t)mesh->nv + 1, sizeof(int));
    if (!head || !m) {
        clothi_free(hooks, head), cloth_mesh_destroy(hooks, m);
        return CLOTH_ERR_MEMORY;
    }
    next = head + mesh->nv + 1, to = next + mesh->nv;
    for (i = m->nv = m->nf = 0; i < mesh->nv; i++) {
        const double *p = mesh->x + 3 * i;
        to[i] = clothi_weld_find(m->x, p, distance, head, next, mesh->nv + 1, &home);
        if (to[i] >= 0) continue;
        to[i] = m->nv++, next[to[i]] = head[home], head[home] = m->nv;
        memcpy(m->x + 3 * to[i], p, 3 * sizeof *p);
    }
    for (i = 0; i < mesh->nf; i++) {
        int *t = m->faces + 3 * m->nf;
        for (k = 0; k < 3; k++) t[k] = to[mesh->faces[3 * i + k]];
        if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
        if (m->X) memcpy(m->X + 6 * (size_t)m->nf, mesh->X + 6 * (size_t)i, 6 * sizeof *m->X);
        if (m->part) m->part[m->nf] = mesh->part[i];
        m->nf++;
    }
    clothi_free(hooks, head);
    *out = m;
    return CLOTH_OK;
}

/* Faces of the piece of piece[0] into piece, and how they turn into turn [nf]: 1 not, 2 turned.
 * pair [3 nf]: the half-edge on the other side + 1, 0: a boundary, -1: several. Returns how many;
 * 0: one side only. */
static int clothi_orient_piece(cloth_mesh *m, const int *pair, int *turn, int *piece) {
    const double *o = m->x + 3 * m->faces[3 * piece[0]];
    double        volume = 0;
    int           i, k, n = 1, open = 0, turned = 0;
    turn[piece[0]] = 1;
    for (i = 0; i < n; i++) {
        const int *t = m->faces + 3 * piece[i];
        double     e[9], n12[3];
        for (k = 0; k < 9; k++) e[k] = m->x[3 * t[k / 3] + k % 3] - o[k % 3];
        clothi_cross3(e + 6, e + 3, n12);
        volume += (2 * turn[piece[i]] - 3) * clothi_dot3(e, n12);
        turned += turn[piece[i]] == 2;
        for (k = 0; k < 3; k++) {
            const int g = pair[3 * piece[i] + k] - 1;
            const int want = g >= 0 && t[k] == m->faces[g] ? 3 - turn[piece[i]] : turn[piece[i]];
            if (g < 0) open |= g == -1;
            else if (!turn[g / 3]) turn[g / 3] = want, piece[n++] = g / 3;
            else if (turn[g / 3] != want) return 0;
        }
    }
    if (open ? 2 * turned > n : volume < 0)
        for (i = 0; i < n; i++) turn[piece[i]] = 3 - turn[piece[i]];
    return n;
}

static void clothi_turn_face(cloth_mesh *m, int f) {
    double   *X = m->X ? m->X + 6 * (size_t)f : NULL, u;
    const int b = m->faces[3 * f + 1], r = m->nr > 0 ? m->render_faces[3 * f + 1] : 0;
    m->faces[3 * f + 1] = m->faces[3 * f + 2], m->faces[3 * f + 2] = b;
    if (m->nr > 0)
        m->render_faces[3 * f + 1] = m->render_faces[3 * f + 2], m->render_faces[3 * f + 2] = r;
    if (!X) return;
    u = X[2], X[2] = -X[4], X[4] = -u, X[0] = -X[0];
    u = X[3], X[3] = X[5], X[5] = u;
}

CLOTH_API cloth_status cloth_mesh_orient(const cloth_hooks *hooks, cloth_mesh *mesh, int *turned) {
    clothi_edge_sort sort;
    cloth_status     status;
    int             *pair, *turn, *piece, i, j, k, f, n = 0, got;
    if (turned) *turned = 0;
    if (!mesh) return clothi_null(hooks, "cloth_mesh_orient: mesh");
    status = clothi_mesh_arrays(hooks, mesh, -1);
    if (!status) status = clothi_edge_sort_make(hooks, mesh->nv, mesh->nf, mesh->faces, &sort);
    if (status) return status;
    pair = (int *)clothi_alloc(hooks, 5 * (size_t)mesh->nf + 1, sizeof(int));
    if (!pair) {
        clothi_free(hooks, sort.lo);
        return CLOTH_ERR_MEMORY;
    }
    turn = pair + 3 * mesh->nf, piece = turn + mesh->nf;
    for (i = 0; i < 3 * mesh->nf; i = j) {
        j = clothi_edge_run(&sort, 3 * mesh->nf, i);
        for (k = i; k < j && j > i + 1; k++)
            pair[sort.order[k]] = j > i + 2 ? -1 : sort.order[2 * i + 1 - k] + 1;
    }
    clothi_free(hooks, sort.lo);
    for (f = 0; f < mesh->nf && !status; f++) {
        if (turn[f]) continue;
        piece[n] = f;
        if ((got = clothi_orient_piece(mesh, pair, turn, piece + n)) == 0)
            status = clothi_fail(hooks, CLOTH_ERR_MESH, "face %i: its piece has one side only", f);
        n += got;
    }
    for (f = 0; f < mesh->nf && !status; f++) {
        if (turn[f] == 2) clothi_turn_face(mesh, f);
        if (turned) *turned += turn[f] == 2;
    }
    clothi_free(hooks, pair);
    return status;
}

/* ===== [5.1] MATERIALS ======================================================================= */
/*
 *   Y Pa, h m: a sheet that is pulled along one direction with free sides carries Y h (l^2-1)/2 l
 *   per width and narrows by nu. Only plane stress gives that back in two dimensions:
 *     mu = Y h/(2 (1+nu)),   lambda = Y h nu/(1-nu^2)                                        N/m
 *   Derivation. A solid has S_ij = L tr(E) d_ij + 2 m E_ij, tr over three axes, m = Y/(2(1+nu)),
 *   L = Y nu/((1+nu)(1-2nu)). The faces of a sheet are free: S_33 = 0, so that
 *     E_33 = -L (E_11 + E_22)/(L + 2 m),   L tr(E) = 2 m L/(L + 2 m) (E_11 + E_22):
 *   the same law in two dimensions, with lambda/h = 2 m L/(L + 2 m). L + 2 m is Y(1-nu)/((1+nu)
 *   (1-2nu)), L/(L + 2 m) = nu/(1-nu), hence lambda/h = 2 m nu/(1-nu) = Y nu/(1-nu^2). Pulled with
 *   free sides, S_22 = 0: E_22 = -lambda/(lambda + 2 mu) E_11 = -nu E_11, and S_11 = (2 mu + lambda
 *   (1-nu)) E_11 = Y h E_11, as it should be.
 *   The lambda of a solid, L h, is that of a sheet held between two plates (E_33 = 0): it acts
 *   like Y/(1-nu^2) and nu/(1-nu), and grows without bound as nu goes to 1/2.
 *   Rigidity of a plate: rolled to a curvature k, the layer at height z is strained by z k along
 *   the roll and not at all across, E_22 = 0: its stress is Y/(1-nu^2) z k. The moment per width,
 *   integral of z times that from -h/2 to h/2, is D k with D = Y h^3/(12 (1-nu^2)), N m. Yarns
 *   slide and bend one by one: cloth is no plate; give D where it was measured.
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
    static const clothi_rule rule[7] = {
        CLOTHI_RULE(cloth_material, density, 1, CLOTHI_OVER, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_material, young, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_material, thickness, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_material, membrane, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_material, poisson, 1, CLOTHI_OVER, -1, 0.5),
        CLOTHI_RULE(cloth_material, bending, 1, 0, -CLOTHI_HUGE, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_material, damping, 1, 0, 0, CLOTHI_HUGE)};
    char         name[32];
    const char  *who = clothi_member(name, "material", region);
    double       mu, lambda;
    cloth_status status = m ? clothi_check_rules(hooks, who, m, rule, 7)
                            : clothi_null(hooks, "cloth_material_check: m");
    if (!status && m->plane != CLOTH_PLANE_STRESS && m->plane != CLOTH_PLANE_STRAIN_3D)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%splane = %i is no cloth_plane", who,
                           (int)m->plane);
    if (!status && m->plane == CLOTH_PLANE_STRAIN_3D)
        status = clothi_check_range(hooks, who, "CLOTH_PLANE_STRAIN_3D: poisson", m->poisson, -1,
                                    0.5, CLOTHI_OVER | CLOTHI_UNDER);
    if (status) return status;
    cloth_material_lame(m, &mu, &lambda);
    if (!clothi_finite(mu) || !clothi_finite(lambda) || !clothi_finite(cloth_material_rigidity(m)))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%syoung = %g, thickness = %g, membrane = %g:"
                           " beyond any double", who, m->young, m->thickness, m->membrane);
    return CLOTH_OK;
}

CLOTHI_RARE_END

/* ===== [6.1] LANES, SPRING =================================================================== */
/*
 *   a batch: 8 elements, one array per number           x [9][8]: corner*3 + axis, then the lane
 *
 *      lane   0   1   2   3   4   5   6   7             The loops of this chapter run over lanes
 *   x0.x      .   .   .   .   .   .   .   .             and have no branch, so that gcc and clang
 *   x0.y      .   .   .   .   .   .   .   .             turn them into vector code by themselves.
 *   ...                                                 Unused lanes repeat a valid element with
 *                                                       zero stiffness.
 *   Each formula stands once, for lanes; cloth_spring and its like are one element in all of them.
 *   An element has a measure q(x) (length, strain, angle, ...) and an energy that is a square of
 *   q - q0, q0 at rest. Its functions, whose outputs are all given:
 *
 *     _measure  q                                              [numbers][8]
 *     _lanes    E, Ed and the gradient f of their sum          [8], [8], [3 corners][8]
 *     _blocks   Hessian, blocks (i, j) of corners i > j        [pairs][9][8], as clothi_pair,
 *               at x; of triangles with the stress that was predicted at `was` [9.2], or x
 *     _vjp      V = a.f, a constant: dV by the numbers of `rest`, by damp and by x^n, and Ha, that
 *               by x: Hessian times a, without a matrix; x^n is x itself: damp is zeros, dV by it
 *               and by x^n is not asked for
 *
 *   No force changes when all corners move together: rows of blocks sum to zero, which gives the
 *   diagonal blocks, once for a matrix and not by element (clothi_matrix_close()). A result beyond
 *   the range of doubles is left as inf or NaN for the step to refuse. Lengths are expected within
 *   1e-20 .. 1e20 m.
 *
 *   damping   The energy's formula for what q has changed by since the step's start x^n, times
 *             damp = tau/h, tau the material's time:
 *               Ed = (tau/h) A ( mu |E - E^n|^2 + lambda/2 tr(E - E^n)^2 ),
 *               Ed = (tau/h) c/2 (theta - theta^n)^2, ...
 *             so dEd/dx = tau d/dt of the elastic force for small steps. Strain, angle and length
 *             do not change in a rigid motion, so that nothing is taken from it. start = q(x^n);
 *             start and damp are zeros without damping.
 *   forces    are stored per element and summed per vertex from a list in a fixed order: no
 *             colouring, no atomics, the same bits for any number of workers.
 *
 *        x0 o~~~~~~~~~~o x1        symbols  d = x1 - x0,  l = |d|,  u = d/l
 *                                           L rest length m, k stiffness N/m, s = damp
 *   energy    E = k/2 (l - L)^2                                                            J
 *   gradient  dE/dx1 = k (l - L) u = -dE/dx0          as dl/dx1 = u                        N
 *   Hessian   d2E/dx1dx1 = K, d2E/dx0dx1 = -K         as du/dx1 = (I - u u')/l             N/m
 *             K = k [ u u' + (1 - L/l) (I - u u') ] = k [ (1 - L/l) I + (L/l) u u' ]
 *   damped    p = k (1 + s - (L + s l_n)/l) takes the place of k (1 - L/l): the gradient is p d,
 *             K = p I + (k (1 + s) - p) u u'
 *   psd       the eigenvalues of K are k along u and k (1 - L/l), twice, across: the second is
 *             negative in compression (l < L) and then replaced by 0. The 6x6 matrix
 *             [K -K; -K K] has v' H v = (v1 - v0)' K (v1 - v0) >= 0.
 *   dropped   nothing. At l = 0 < L the direction u does not exist: below l = 1e-8 L the code takes
 *             u = d / (1e-8 L), which fades to zero, and the force with it. L = 0 is exact there.
 *   checked   tests/test_elements.c: spring_derivatives, spring_degenerate, lanes_spring,
 *             lanes_damping, lanes_products, lanes_gather
 */

#define CLOTHI_LANES 8

enum { CLOTHI_SPRING = 0, CLOTHI_TRIANGLE = 1, CLOTHI_HINGE = 2, CLOTHI_QUADRATIC = 3 };

typedef const double *CLOTHI_RESTRICT clothi_in;       /* arrays of lanes that do not overlap    */
typedef double *CLOTHI_RESTRICT       clothi_out;

static const int    clothi_pair[6][2] = {{1, 0}, {2, 0}, {2, 1}, {3, 0}, {3, 1}, {3, 2}};
static const double clothi_none[3 * CLOTHI_LANES] = {0};        /* start, damp without damping   */
static const double clothi_one[CLOTHI_LANES] = {1, 1, 1, 1, 1, 1, 1, 1};

/* sqrt may set errno, which keeps compilers from vectorising it. */
CLOTHI_HOT void clothi_sqrt_lanes(double *a) {
    int k;
#if defined(CLOTHI_SSE2)
    for (k = 0; k < CLOTHI_LANES; k += 2) _mm_storeu_pd(a + k, _mm_sqrt_pd(_mm_loadu_pd(a + k)));
#else
    for (k = 0; k < CLOTHI_LANES; k++) a[k] = sqrt(a[k]);
#endif
}

/* Positions of 8 elements into out [corners*3][8]: x [nv x 3], index [corners][8] vertices. */
CLOTHI_HOT void clothi_gather_lanes(clothi_in x, const int *CLOTHI_RESTRICT index, int corners,
                                    clothi_out out) {
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
 * batches' forces: entry[start[v] .. stop[v]) are offsets of the axis x, y and z lie 8 and 16
 * further. */
CLOTHI_HOT void clothi_sum_corners(clothi_in forces, const int *start, const int *stop,
                                   const int *CLOTHI_RESTRICT entry, int begin, int end,
                                   double scale, clothi_out f) {
    int v, k;
    for (v = begin; v < end; v++) {
        double s0 = 0.0, s1 = 0.0, s2 = 0.0;
        for (k = start[v]; k < stop[v]; k++) {
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

/* --- one lane of a vector --- */

typedef struct clothi_vec { double x, y, z; } clothi_vec;

CLOTHI_LANE clothi_vec clothi_vec_of(double x, double y, double z) {
    const clothi_vec v = {x, y, z};
    return v;
}

/* Row `row` of lane k in an array of lanes, and the two behind it. */
CLOTHI_LANE clothi_vec clothi_vec_at(const double *a, int row, int k) {
    return clothi_vec_of(a[row * CLOTHI_LANES + k], a[(row + 1) * CLOTHI_LANES + k],
                         a[(row + 2) * CLOTHI_LANES + k]);
}

CLOTHI_LANE void clothi_vec_put(double *out, int row, int k, clothi_vec a) {
    out[row * CLOTHI_LANES + k] = a.x;
    out[(row + 1) * CLOTHI_LANES + k] = a.y;
    out[(row + 2) * CLOTHI_LANES + k] = a.z;
}

CLOTHI_LANE clothi_vec clothi_vec_times(double s, clothi_vec a) {
    return clothi_vec_of(s * a.x, s * a.y, s * a.z);
}

/* a + t b */
CLOTHI_LANE clothi_vec clothi_vec_plus(clothi_vec a, double t, clothi_vec b) {
    return clothi_vec_of(a.x + t * b.x, a.y + t * b.y, a.z + t * b.z);
}

/* s a + t b */
CLOTHI_LANE clothi_vec clothi_vec_mix(double s, clothi_vec a, double t, clothi_vec b) {
    return clothi_vec_plus(clothi_vec_times(s, a), t, b);
}

CLOTHI_LANE double clothi_vec_dot(clothi_vec a, clothi_vec b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

CLOTHI_LANE clothi_vec clothi_vec_cross(clothi_vec a, clothi_vec b) {
    return clothi_vec_of(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

/* x_i - x_0 */
CLOTHI_LANE clothi_vec clothi_edge(const double *x, int i, int k) {
    return clothi_vec_plus(clothi_vec_at(x, 3 * i, k), -1.0, clothi_vec_at(x, 0, k));
}

/* --- springs: x [6][8], rest [2][8] = k, L --- */

/* |x1 - x0|; of hinges as well. */
CLOTHI_HOT void clothi_spring_measure(clothi_in x, clothi_in rest, clothi_out l) {
    int k;
    (void)rest;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_vec d = clothi_edge(x, 1, k);
        l[k] = clothi_vec_dot(d, d);
    }
    clothi_sqrt_lanes(l);
}

typedef struct clothi_bar {                 /* one lane                                          */
    clothi_vec d;                           /* x1 - x0                                           */
    double     inv, pull;                   /* 1/l with its floor, p                             */
} clothi_bar;

CLOTHI_LANE clothi_bar clothi_bar_at(const double *x, const double *rest, const double *start,
                                     const double *damp, const double *l, int k) {
    const double r = rest[CLOTHI_LANES + k], floor_ = 1e-8 * r, s = damp[k];
    clothi_bar   b;
    b.d = clothi_edge(x, 1, k);
    b.inv = 1.0 / ((l[k] > floor_ ? l[k] : floor_) + 1e-300);
    b.pull = rest[k] * (1.0 + s - (r + s * start[k]) * b.inv);
    return b;
}

/* g for corner 1, -g for corner 0 */
CLOTHI_LANE void clothi_bar_put(double *f, int k, clothi_vec g) {
    clothi_vec_put(f, 0, k, clothi_vec_times(-1.0, g));
    clothi_vec_put(f, 3, k, g);
}

CLOTHI_HOT void clothi_spring_lanes(clothi_in x, clothi_in rest, clothi_in start, clothi_in damp,
                                    clothi_out E, clothi_out Ed, clothi_out f) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_spring_measure(x, rest, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_bar b = clothi_bar_at(x, rest, start, damp, l, k);
        const double     longer = l[k] - rest[CLOTHI_LANES + k], change = l[k] - start[k];
        E[k] = 0.5 * rest[k] * longer * longer;
        Ed[k] = 0.5 * rest[k] * damp[k] * change * change;
        clothi_bar_put(f, k, clothi_vec_times(b.pull, b.d));
    }
}

CLOTHI_HOT void clothi_spring_blocks(clothi_in x, clothi_in was, clothi_in rest, clothi_in start,
                                     clothi_in damp, int psd, clothi_out H) {
    enum { L = CLOTHI_LANES };
    double l[L], across[L], along[L], u[3 * L];
    int    k, i, j;
    (void)was;
    clothi_spring_measure(x, rest, l);
    for (k = 0; k < L; k++) {
        const clothi_bar b = clothi_bar_at(x, rest, start, damp, l, k);
        across[k] = psd ? 0.5 * (b.pull + fabs(b.pull)) : b.pull;
        along[k] = rest[k] * (1.0 + damp[k]) - across[k];
        clothi_vec_put(u, 0, k, clothi_vec_times(b.inv, b.d));
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            for (k = 0; k < L; k++)
                H[(3 * i + j) * L + k] = -(along[k] * u[i * L + k] * u[j * L + k] +
                                           (i == j ? across[k] : 0.0));
}

/* V = k ((l - L) + s (l - l_n)) u.(a1 - a0) */
CLOTHI_HOT void clothi_spring_vjp(clothi_in x, clothi_in x_n, clothi_in a, clothi_in rest,
                                  clothi_in damp, clothi_out d_rest, clothi_out d_damp,
                                  clothi_out d_x_n, clothi_out Ha) {
    enum { L = CLOTHI_LANES };
    double l[L], l_n[L];
    int    k;
    clothi_spring_measure(x, rest, l);
    clothi_spring_measure(x_n, rest, l_n);
    for (k = 0; k < L; k++) {
        const clothi_bar b = clothi_bar_at(x, rest, l_n, damp, l, k);
        const clothi_bar n = clothi_bar_at(x_n, rest, l_n, damp, l_n, k);
        const clothi_vec da = clothi_edge(a, 1, k);
        const double     along = clothi_vec_dot(b.d, da) * b.inv, change = l[k] - l_n[k];
        const double     more = (rest[k] * (1.0 + damp[k]) - b.pull) * (along * b.inv);
        clothi_bar_put(Ha, k, clothi_vec_mix(b.pull, da, more, b.d));
        d_rest[k] = (l[k] - rest[L + k] + damp[k] * change) * along;
        d_rest[L + k] = -rest[k] * along;
        d_damp[k] = rest[k] * change * along;
        clothi_bar_put(d_x_n, k, clothi_vec_times(-rest[k] * damp[k] * along * n.inv, n.d));
    }
}

CLOTHI_RARE_BEGIN

/* --- one element: the same in all lanes; see also [6.4] --- */

static void clothi_to_lanes(const double *x, int n, double *out) {
    int i;
    for (i = 0; i < n * CLOTHI_LANES; i++) out[i] = x[i / CLOTHI_LANES];
}

/* scale times lane 0 of a [n][8], all zero where that is not finite. out may be NULL. */
static void clothi_from_lanes(const double *a, int n, double scale, double *out) {
    int i;
    for (i = 0; out && i < n; i++) out[i] = scale * a[i * CLOTHI_LANES];
    clothi_settle(out, (size_t)n);
}

/* Likewise of the blocks H of an element with `width` corners, as a full matrix: diagonal blocks
 * are minus the symmetric parts of their rows' sums. */
static void clothi_full_hessian(const double *H, int width, double scale, double *out) {
    const int n = 3 * width;
    int       p, k, end;
    memset(out, 0, (size_t)(n * n) * sizeof *out);
    for (p = 0; p < width * (width - 1) / 2; p++)
        for (k = 0; k < 9; k++) {
            const double h = scale * H[(9 * p + k) * CLOTHI_LANES];
            const int    r = 3 * clothi_pair[p][0] + k / 3, c = 3 * clothi_pair[p][1] + k % 3;
            out[n * r + c] = out[n * c + r] = h;
            for (end = 0; end < 2; end++) {
                const int d = 3 * clothi_pair[p][end];
                out[n * (d + k / 3) + d + k % 3] -= 0.5 * h;
                out[n * (d + k % 3) + d + k / 3] -= 0.5 * h;
            }
        }
    clothi_settle(out, (size_t)(n * n));
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
 *     J = A ( mu |E|^2 + lambda/2 tr(E)^2 ),  dJ = A S:dE                        [BB08]
 *
 *   Write F = sum_i x_i g_i' with the gradients g_i of the corner functions: g_1, g_2 are the rows
 *   of B, and g_0 = -g_1 - g_2 since the three functions sum to one. A change v of corner i gives
 *     dF = v g_i',   dE = 1/2 (F'dF + dF'F),   S:dE = v . F S g_i        (S is symmetric)
 *   so  gradient  dJ/dx_i = A F S g_i.                                                        N
 *   Change that by w at corner j: A [ w (g_j' S g_i) + F dS g_i ]. With q_i = F g_i and g_ij =
 *   g_i.g_j:  dE g_i = 1/2 (F' w g_ij + g_j q_i.w),  tr dE = w.q_j,  hence
 *     Hessian   H_ij = A [ mu ( g_ij F F' + q_j q_i' ) + lambda q_i q_j' + (g_i' S g_j) I ]  N/m
 *   (in code column by column, w an axis: dE has three numbers and so has dS, and F dS g_i takes
 *   fewer products than the blocks written out).
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
 *   products  along u: A [ F(u) S g_i + F dS g_i ], F(u) = Du B of the edges Du of u, dE =
 *             sym(F' F(u)), dS = 2 mu dE + lambda tr(dE) I, times 1 + s with damping
 *   vjp       V = a . dJ/dx = A S:Ea, Ea = sym(F' F(a)); with S of the strain E + s (E - E^n):
 *               dV/dmu = 2 A (E + s (E - E^n)):Ea,  dV/dlambda = A tr( ) tr( ) of the two,
 *               dV/ds = A C(E - E^n):Ea,  dV/dx^n_i = -s A F^n C(Ea) g_i,  C(Ea) the stress of Ea
 *             Rest corners: dX turns Dm into Dm + dDm and B into B - B dDm B, so each F = Ds B
 *             changes as if the positions behind it moved by -F dX_i, of x, a and x^n alike, and
 *             dA = A tr(B dDm):
 *               dV/dX_i = V g_i - F' (H a)_i - F(a)' (dJ/dx)_i - F^n' (dV/dx^n)_i,   i = 1, 2
 *   checked   tests/test_elements.c: stretch_derivatives, stretch_closed_forms, stretch_table,
 *             stretch_psd, stretch_invariance, stretch_degenerate, lanes_stretch, lanes_products
 */

/* B [2x2] and the area; zeros when the rest triangle has none. */
CLOTHI_OUTLINE static double clothi_rest_inverse(const double *X, double *B) {
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

CLOTHI_RARE_END

/* --- x [9][8], rest [7][8] = B row by row, area, mu, lambda; start [3][8] = E11, E22, E12 --- */

typedef struct clothi_tri {                 /* one lane                                          */
    clothi_vec F1, F2;                      /* columns of F                                      */
    clothi_vec E;                           /* 11, 22, 12, as of every 2x2 matrix here           */
} clothi_tri;

CLOTHI_LANE clothi_tri clothi_tri_at(const double *x, const double *rest, int k) {
    enum { L = CLOTHI_LANES };
    const clothi_vec d = clothi_edge(x, 1, k), h = clothi_edge(x, 2, k);
    clothi_tri       t;
    t.F1 = clothi_vec_mix(rest[k], d, rest[2 * L + k], h);
    t.F2 = clothi_vec_mix(rest[L + k], d, rest[3 * L + k], h);
    t.E.x = 0.5 * (clothi_vec_dot(t.F1, t.F1) - 1.0);
    t.E.y = 0.5 * (clothi_vec_dot(t.F2, t.F2) - 1.0);
    t.E.z = 0.5 * clothi_vec_dot(t.F1, t.F2);
    return t;
}

/* dE for a change of positions whose F is that of u. */
CLOTHI_LANE clothi_vec clothi_tri_change(const clothi_tri *t, const clothi_tri *u) {
    return clothi_vec_of(clothi_vec_dot(t->F1, u->F1), clothi_vec_dot(t->F2, u->F2),
                         0.5 * (t->F1.x * u->F2.x + t->F2.x * u->F1.x + t->F1.y * u->F2.y +
                                t->F2.y * u->F1.y + t->F1.z * u->F2.z + t->F2.z * u->F1.z));
}

/* E + damp (E - E^n): the strain whose elastic stress is the whole stress. */
CLOTHI_LANE clothi_vec clothi_tri_damped(clothi_vec e, clothi_vec start, double damp) {
    return clothi_vec_plus(e, damp, clothi_vec_plus(e, -1.0, start));
}

/* A (mu |e|^2 + lambda/2 tr(e)^2) */
CLOTHI_LANE double clothi_tri_energy(clothi_vec e, const double *rest, int k) {
    enum { L = CLOTHI_LANES };
    return rest[4 * L + k] * (rest[5 * L + k] * (e.x * e.x + e.y * e.y + 2.0 * e.z * e.z)
                              + 0.5 * rest[6 * L + k] * (e.x + e.y) * (e.x + e.y));
}

/* A S of the strain e. */
CLOTHI_LANE clothi_vec clothi_tri_stress(clothi_vec e, const double *rest, int k) {
    enum { L = CLOTHI_LANES };
    const double area = rest[4 * L + k], mu2 = 2.0 * rest[5 * L + k];
    const double tr = rest[6 * L + k] * (e.x + e.y);
    return clothi_vec_of(area * (mu2 * e.x + tr), area * (mu2 * e.y + tr), area * (mu2 * e.z));
}

/* F s g of corners 1 and 2, F of t. */
CLOTHI_LANE void clothi_tri_pull(const clothi_tri *t, clothi_vec s, const double *rest, int k,
                                 clothi_vec *p) {
    enum { L = CLOTHI_LANES };
    const double b0 = rest[k], b1 = rest[L + k], b2 = rest[2 * L + k], b3 = rest[3 * L + k];
    p[0] = clothi_vec_mix(s.x * b0 + s.z * b1, t->F1, s.z * b0 + s.y * b1, t->F2);
    p[1] = clothi_vec_mix(s.x * b2 + s.z * b3, t->F1, s.z * b2 + s.y * b3, t->F2);
}

/* f of the three corners from those of corners 1 and 2. */
CLOTHI_LANE void clothi_tri_put(double *f, int k, clothi_vec p, clothi_vec q) {
    clothi_vec_put(f, 0, k, clothi_vec_mix(-1.0, p, -1.0, q));
    clothi_vec_put(f, 3, k, p);
    clothi_vec_put(f, 6, k, q);
}

CLOTHI_LANE void clothi_tri_force(const clothi_tri *t, clothi_vec s, const double *rest, int k,
                                  double *f) {
    clothi_vec p[2];
    clothi_tri_pull(t, s, rest, k, p);
    clothi_tri_put(f, k, p[0], p[1]);
}

CLOTHI_HOT void clothi_stretch_measure(clothi_in x, clothi_in rest, clothi_out strain) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++)
        clothi_vec_put(strain, 0, k, clothi_tri_at(x, rest, k).E);
}

/* LEAPFROG's path without bending: nothing but elastic forces. */
CLOTHI_HOT void clothi_stretch_forces(clothi_in x, clothi_in rest, clothi_out f) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        clothi_tri_force(&t, clothi_tri_stress(t.E, rest, k), rest, k, f);
    }
}

CLOTHI_HOT void clothi_stretch_lanes(clothi_in x, clothi_in rest, clothi_in start, clothi_in damp,
                                     clothi_out E, clothi_out Ed, clothi_out f) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        const clothi_vec n = clothi_vec_at(start, 0, k), e = clothi_tri_damped(t.E, n, damp[k]);
        E[k] = clothi_tri_energy(t.E, rest, k);
        Ed[k] = damp[k] * clothi_tri_energy(clothi_vec_plus(t.E, -1.0, n), rest, k);
        clothi_tri_force(&t, clothi_tri_stress(e, rest, k), rest, k, f);
    }
}

/* Squares of the principal stretches, the eigenvalues of F'F, good to 1e-16 of the larger one. */
CLOTHI_HOT void clothi_stretch_squares(clothi_in x, clothi_in rest, clothi_out low,
                                       clothi_out high) {
    double radius[CLOTHI_LANES];
    int    k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        high[k] = 1.0 + t.E.x + t.E.y;
        radius[k] = (t.E.x - t.E.y) * (t.E.x - t.E.y) + 4.0 * t.E.z * t.E.z;
    }
    clothi_sqrt_lanes(radius);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const double s = high[k] - radius[k];
        low[k] = 0.5 * (s + fabs(s));
        high[k] += radius[k];
    }
}

/* What every Hessian block needs of a lane. */
typedef struct clothi_tri_batch {
    double F[6 * CLOTHI_LANES], g[6 * CLOTHI_LANES];    /* F by columns, g by corners            */
    double mu2[CLOTHI_LANES], lambda[CLOTHI_LANES];     /* A (1 + damp) times 2 mu and lambda    */
    double s[3 * CLOTHI_LANES], radius[CLOTHI_LANES];   /* A S, 11 22 12; squared                */
} clothi_tri_batch;

/* S of the strain at x that was predicted at `was`, without 1/2 dF'dF: 'Which stress' [9.2]. */
CLOTHI_HOT void clothi_stretch_prepare(clothi_in x, clothi_in was, clothi_in rest, clothi_in start,
                                       clothi_in damp, clothi_tri_batch *CLOTHI_RESTRICT w) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k), o = clothi_tri_at(was, rest, k);
        const clothi_vec d1 = clothi_vec_plus(t.F1, -1.0, o.F1);
        const clothi_vec d2 = clothi_vec_plus(t.F2, -1.0, o.F2);
        const clothi_vec q = clothi_vec_of(clothi_vec_dot(d1, d1), clothi_vec_dot(d2, d2),
                                           clothi_vec_dot(d1, d2));
        const clothi_vec e = clothi_tri_damped(clothi_vec_plus(t.E, -0.5, q),
                                               clothi_vec_at(start, 0, k), damp[k]);
        const clothi_vec s = clothi_tri_stress(e, rest, k);
        const double     b0 = rest[k], b1 = rest[L + k], b2 = rest[2 * L + k], b3 = rest[3 * L + k];
        const double     scale = rest[4 * L + k] * (1.0 + damp[k]), half = 0.5 * (s.x - s.y);
        clothi_vec_put(w->F, 0, k, t.F1);
        clothi_vec_put(w->F, 3, k, t.F2);
        clothi_vec_put(w->g, 0, k, clothi_vec_of(-b0 - b2, -b1 - b3, b0));
        clothi_vec_put(w->g, 3, k, clothi_vec_of(b1, b2, b3));
        clothi_vec_put(w->s, 0, k, s);
        w->radius[k] = half * half + s.z * s.z;
        w->mu2[k] = 2.0 * scale * rest[5 * L + k];
        w->lambda[k] = scale * rest[6 * L + k];
    }
}

/* psd == 2 asks for the reflected model: a negative principal stress s counts as
 * CLOTHI_REFLECT |s| instead of 0: still semidefinite, and shorter steps. */
#define CLOTHI_REFLECT 0.5

/* S+ = a S + b I, or its reflected twin. */
CLOTHI_HOT void clothi_stretch_positive(clothi_tri_batch *CLOTHI_RESTRICT w, int psd) {
    enum { L = CLOTHI_LANES };
    const double reflect = psd > 1 ? CLOTHI_REFLECT : 0.0;
    const double keep = 0.5 * (1.0 - reflect), turn = 0.5 * (1.0 + reflect);
    int          k;
    clothi_sqrt_lanes(w->radius);
    for (k = 0; k < L; k++) {
        const double mean = 0.5 * (w->s[k] + w->s[L + k]), r = w->radius[k];
        const double up = mean + r, down = mean - r;
        const double hi = keep * up + turn * fabs(up), lo = keep * down + turn * fabs(down);
        const double a = 0.5 * (hi - lo) / (r + 1e-300), b = 0.5 * (hi + lo) - a * mean;
        w->s[k] = a * w->s[k] + b;
        w->s[L + k] = a * w->s[L + k] + b;
        w->s[2 * L + k] = a * w->s[2 * L + k];
    }
}

/* Column by column: corner j moves along axis r, dF = e_r g_j' and dE = sym(F'dF); the force on
 * corner i changes by F dS g_i + (g_i' S g_j) e_r. */
CLOTHI_HOT void clothi_stretch_columns(const clothi_tri_batch *CLOTHI_RESTRICT w, clothi_out H) {
    enum { L = CLOTHI_LANES };
    int p, r, k;
    for (p = 0; p < 3; p++) {
        const double *i = w->g + 2 * clothi_pair[p][0] * L, *j = w->g + 2 * clothi_pair[p][1] * L;
        for (r = 0; r < 3; r++) {
            const double *F1 = w->F, *F2 = F1 + 3 * L, *r1 = F1 + r * L, *r2 = F2 + r * L;
            double       *h = H + (9 * p + r) * L;
            for (k = 0; k < L; k++) {
                const double a = r1[k] * j[k], b = r2[k] * j[L + k];
                const double tr = w->lambda[k] * (a + b), s0 = w->mu2[k] * a + tr;
                const double s1 = w->mu2[k] * b + tr;
                const double s2 = 0.5 * w->mu2[k] * (r1[k] * j[L + k] + r2[k] * j[k]);
                const double m0 = s0 * i[k] + s2 * i[L + k], m1 = s2 * i[k] + s1 * i[L + k];
                h[k] = F1[k] * m0 + F2[k] * m1;
                h[3 * L + k] = F1[L + k] * m0 + F2[L + k] * m1;
                h[6 * L + k] = F1[2 * L + k] * m0 + F2[2 * L + k] * m1;
            }
        }
        for (k = 0; k < L; k++) {
            const double work = w->s[k] * i[k] * j[k] + w->s[L + k] * i[L + k] * j[L + k] +
                                w->s[2 * L + k] * (i[k] * j[L + k] + i[L + k] * j[k]);
            H[9 * p * L + k] += work;
            H[(9 * p + 4) * L + k] += work;
            H[(9 * p + 8) * L + k] += work;
        }
    }
}

CLOTHI_UNUSED static void clothi_stretch_blocks(clothi_in x, clothi_in was, clothi_in rest,
                                                clothi_in start, clothi_in damp, int psd,
                                                clothi_out H) {
    clothi_tri_batch w;
    clothi_stretch_prepare(x, was, rest, start, damp, &w);
    if (psd) clothi_stretch_positive(&w, psd);
    clothi_stretch_columns(&w, H);
}

/* d(F S g) = dF S g + F dS g, dF of d, A S and A dS given. */
CLOTHI_LANE void clothi_tri_product(const clothi_tri *t, const clothi_tri *d, clothi_vec s,
                                    clothi_vec ds, const double *rest, int k, double *f) {
    clothi_vec p[2], q[2];
    clothi_tri_pull(d, s, rest, k, p);
    clothi_tri_pull(t, ds, rest, k, q);
    clothi_tri_put(f, k, clothi_vec_plus(p[0], 1.0, q[0]), clothi_vec_plus(p[1], 1.0, q[1]));
}

/* X_i -= F' (of t) F s g_i (of u), of the corners i = 1, 2 */
CLOTHI_LANE void clothi_tri_back(const clothi_tri *t, const clothi_tri *u, clothi_vec s,
                                 const double *rest, int k, double *X) {
    enum { L = CLOTHI_LANES };
    clothi_vec p[2];
    clothi_tri_pull(u, s, rest, k, p);
    X[k] -= clothi_vec_dot(t->F1, p[0]);
    X[L + k] -= clothi_vec_dot(t->F2, p[0]);
    X[2 * L + k] -= clothi_vec_dot(t->F1, p[1]);
    X[3 * L + k] -= clothi_vec_dot(t->F2, p[1]);
}

/* d_rest: in place of B the rest corners X1, X2, with what they do to the area; the fifth is 0.
 * V = mu dV/dmu + lambda dV/dlambda. */
CLOTHI_HOT void clothi_stretch_vjp(clothi_in x, clothi_in x_n, clothi_in a, clothi_in rest,
                                   clothi_in damp, clothi_out d_rest, clothi_out d_damp,
                                   clothi_out d_x_n, clothi_out Ha) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k), n = clothi_tri_at(x_n, rest, k);
        const clothi_tri d = clothi_tri_at(a, rest, k);
        const clothi_vec since = clothi_vec_plus(t.E, -1.0, n.E), da = clothi_tri_change(&t, &d);
        const clothi_vec e = clothi_tri_damped(t.E, n.E, damp[k]);
        const double     mu = 2 * rest[4 * L + k] * (e.x * da.x + e.y * da.y + 2 * e.z * da.z);
        const double     lambda = rest[4 * L + k] * (e.x + e.y) * (da.x + da.y);
        const double     V = rest[5 * L + k] * mu + rest[6 * L + k] * lambda;
        const clothi_vec s = clothi_tri_stress(e, rest, k), ds = clothi_tri_stress(da, rest, k);
        const clothi_vec ds_x = clothi_vec_times(1.0 + damp[k], ds);
        const clothi_vec ds_n = clothi_vec_times(-damp[k], ds);
        d_rest[k] = V * rest[k], d_rest[L + k] = V * rest[L + k];
        clothi_vec_put(d_rest, 2, k, clothi_vec_of(V * rest[2 * L + k], V * rest[3 * L + k], 0.0));
        d_rest[5 * L + k] = mu, d_rest[6 * L + k] = lambda;
        clothi_tri_back(&t, &d, s, rest, k, d_rest);
        clothi_tri_back(&t, &t, ds_x, rest, k, d_rest);
        clothi_tri_back(&d, &t, s, rest, k, d_rest);
        clothi_tri_back(&n, &n, ds_n, rest, k, d_rest);
        clothi_tri_product(&t, &d, s, ds_x, rest, k, Ha);
        clothi_tri_force(&n, ds_n, rest, k, d_x_n);
        d_damp[k] = ds.x * since.x + ds.y * since.y + 2 * ds.z * since.z;
    }
}

CLOTHI_RARE_BEGIN

/* The stretches are the singular values of F: s1^2 and s2^2 are the eigenvalues of F'F, and s1 s2 =
 * |F1 x F2| keeps the digits of the small one. F is scaled so that no square overflows. */
static void clothi_principal_stretches(const double *F, double *stretch) {
    const double big = clothi_max_abs(F, 6);
    double       a[3], b[3], n[3], aa, bb, ab, s1;
    int          i;
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
    stretch[1] = clothi_min(s1, sqrt(clothi_dot3(n, n)) / s1) * big;
}

CLOTH_API double cloth_stretch_state(const double *x, const double *X, double mu, double lambda,
                                     double *F, double *E, double *S, double *stretch) {
    double       y[9 * CLOTHI_LANES], rest[7 * CLOTHI_LANES], B[7];
    double       f[6] = {0}, e[4] = {0}, s[4] = {0}, st[2];
    const double area = clothi_rest_inverse(X, B);
    B[4] = 1.0, B[5] = mu, B[6] = lambda;
    clothi_to_lanes(x, 9, y);
    clothi_to_lanes(B, 7, rest);
    if (area > 0.0) {
        const clothi_tri t = clothi_tri_at(y, rest, 0);
        const clothi_vec stress = clothi_tri_stress(t.E, rest, 0);
        f[0] = t.F1.x, f[2] = t.F1.y, f[4] = t.F1.z, f[1] = t.F2.x, f[3] = t.F2.y, f[5] = t.F2.z;
        e[0] = t.E.x, e[1] = e[2] = t.E.z, e[3] = t.E.y;
        s[0] = stress.x, s[1] = s[2] = stress.z, s[3] = stress.y;
    }
    clothi_settle(f, 6);
    clothi_settle(e, 4);
    clothi_settle(s, 4);
    clothi_principal_stretches(f, st);
    clothi_settle(st, 2);
    if (F) memcpy(F, f, sizeof f);
    if (stretch) memcpy(stretch, st, sizeof st);
    if (E) memcpy(E, e, sizeof e);
    if (S) memcpy(S, s, sizeof s);
    return clothi_finite(area) ? area : CLOTHI_HUGE;
}

CLOTHI_RARE_END

/* ===== [6.3] HINGE =========================================================================== */
/*
 *            x2                symbols  e = x1-x0, a = x2-x0, b = x3-x0, l = |e|, u = e/l
 *           /  \                        n1 = e x a, n2 = b x e normals, |n| = twice the area
 *     n1   /    \                       for each wing: nn = n/|n|, height h = |n|/l,
 *         /      \                        foot t = (corner - x0).u/l (0 at x0, 1 at x1),
 *       x0 --e--> x1                      m the unit vector in its plane from edge to corner
 *         \      /             theta    = atan2( (n1 x n2).u, n1.n2 ) = atan2( -l n1.b, n1.n2 )
 *     n2   \    /                       in [-pi, pi]: 0 flat, > 0 convex on the normals' side
 *           \  /               energy   J = c/2 (theta - theta0)^2, not wrapped        [GHDS03]
 *            x3                c        = D l^2/(A1 + A2) with rest length and areas, N m
 *
 *   wrap      cloth_bend is the formula as it stands. The lanes of a sim take the difference
 *             into [-pi, pi] by a whole turn first: theta leaps from pi to -pi where a fold closes,
 *             and a sharp rest fold, theta0 = 2.5, closes 0.64 beyond it. Unwrapped the energy
 *             leaps there from c/2 0.64^2 to c/2 5.64^2, a wall with no minimum at its foot: no
 *             line search comes to an end on it. Wrapped, J is continuous in x alone, without
 *             memory; its ridge is half a turn from rest, and no minimum rests on a ridge. Both
 *             agree while |theta - theta0| <= pi: always when theta0 = 0. The turn since t^n, of
 *             the damping, is wrapped alike; theta0 is without its whole turns beforehand.
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
 *   wall      A corner pressed through its edge turns its wing over: theta leaps by pi at h = 0, a
 *             wall that no derivative foretells, and what moves along with it is held up. Once an
 *             update was halved, the search's matrix has c pi^2 W_i W_j M M' more where h is below
 *             CLOTHI_HINGE_FLAT l: h all used up costs c pi^2/2, what the leap costs at most, and
 *             as |theta - theta0| <= pi, M p' is outweighed too. A minimum may be at h = 0, with
 *             force left.
 *   collapse  p grows like 1/h. With s = |e|^2 + |a|^2 + |b|^2, |n| is not taken
 *             smaller than 1e-6 s, nor l^2 smaller than 1e-12 s, where they divide: derivatives are
 *             exact above and fade to zero below, where the force would be beyond any use. theta
 *             itself is atan2's answer, any for a wing with n = 0: a line has no side.
 *   range     theta does not depend on size: coordinates outside 1e-20..1e20 are scaled first.
 *   limits    at theta = +-pi (a wing folded onto the other) theta jumps; count hinges beyond 3.
 *             The Poisson ratio of bending is about -1/3 whatever the user says.
 *   checked   tests/test_elements.c: hinge_derivatives, hinge_near_degenerate, hinge_sign,
 *             hinge_cylinder, hinge_invariance, hinge_degenerate, lanes_hinge,
 *             lanes_hinge_wrapped, lanes_products; tests/test_newton.c: pressed_flat
 */

#define CLOTHI_HINGE_FLOOR 1e-12            /* the square of the smallest relative |n|           */
#define CLOTHI_HINGE_FLAT  0.1              /* h/l: see 'wall'                                   */
#define CLOTHI_HINGE_TINY_L2 1e-60          /* m^2 and m^4: keep 0/0 away when all corners       */
#define CLOTHI_HINGE_TINY_Q  1e-100         /* coincide                                          */

/* --- x [12][8], rest [2][8] = c, theta0; start [8] = theta^n --- */

typedef struct clothi_fold {                /* one lane                                          */
    clothi_vec e, a, b;
    clothi_vec n, m;                        /* normals of the left and right wing                */
    double     l2, ae, be, sine, cosine;
} clothi_fold;

CLOTHI_LANE clothi_fold clothi_fold_at(const double *x, const double *l, int k) {
    clothi_fold h;
    h.e = clothi_edge(x, 1, k), h.a = clothi_edge(x, 2, k), h.b = clothi_edge(x, 3, k);
    h.n = clothi_vec_cross(h.e, h.a);
    h.m = clothi_vec_cross(h.b, h.e);
    h.l2 = clothi_vec_dot(h.e, h.e);
    h.ae = clothi_vec_dot(h.a, h.e);
    h.be = clothi_vec_dot(h.b, h.e);
    h.sine = -l[k] * clothi_vec_dot(h.n, h.b);
    h.cosine = clothi_vec_dot(h.n, h.m);
    return h;
}

/* One division for three quotients, with the floors of the banner. */
typedef struct clothi_fold_inverse {
    double l2, q1, q2;                      /* 1/l^2, 1/|n1|^2, 1/|n2|^2                         */
    double l2c;                             /* what the first is the inverse of                  */
    double n1, n2;                          /* |n1|^2, |n2|^2                                    */
} clothi_fold_inverse;

CLOTHI_LANE clothi_fold_inverse clothi_fold_invert(const clothi_fold *h) {
    const double s = h->l2 + clothi_vec_dot(h->a, h->a) + clothi_vec_dot(h->b, h->b);
    const double lf = CLOTHI_HINGE_FLOOR * s + CLOTHI_HINGE_TINY_L2;
    const double qf = CLOTHI_HINGE_FLOOR * s * s + CLOTHI_HINGE_TINY_Q;
    clothi_fold_inverse v;
    double              q1c, q2c, q12, inv, invl;
    v.n1 = clothi_vec_dot(h->n, h->n);
    v.n2 = clothi_vec_dot(h->m, h->m);
    v.l2c = h->l2 > lf ? h->l2 : lf;
    q1c = v.n1 > qf ? v.n1 : qf;
    q2c = v.n2 > qf ? v.n2 : qf;
    q12 = q1c * q2c;
    inv = 1.0 / (v.l2c * q12);
    invl = inv * v.l2c;
    v.l2 = inv * q12;
    v.q1 = invl * q2c;
    v.q2 = invl * q1c;
    return v;
}

/* moment times dtheta/dx */
CLOTHI_LANE void clothi_fold_force(const clothi_fold *h, double l, double moment, int k,
                                   double *f) {
    const clothi_fold_inverse v = clothi_fold_invert(h);
    const double t1 = h->ae * v.l2, t2 = h->be * v.l2, ml = moment * l;
    const clothi_vec p = clothi_vec_times(ml * v.q1, h->n);
    const clothi_vec r = clothi_vec_times(ml * v.q2, h->m);
    const clothi_vec g = clothi_vec_mix(t1, p, t2, r);
    clothi_vec_put(f, 0, k, clothi_vec_plus(clothi_vec_plus(p, 1.0, r), -1.0, g));
    clothi_vec_put(f, 3, k, g);
    clothi_vec_put(f, 6, k, clothi_vec_times(-1.0, p));
    clothi_vec_put(f, 9, k, clothi_vec_times(-1.0, r));
}

CLOTHI_HOT void clothi_hinge_measure(clothi_in x, clothi_in rest, clothi_out theta) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_spring_measure(x, rest, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        theta[k] = clothi_atan2(h.sine, h.cosine);
    }
}

CLOTHI_HOT void clothi_hinge_lanes(clothi_in x, clothi_in rest, clothi_in start, clothi_in damp,
                                   clothi_out E, clothi_out Ed, clothi_out f) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_spring_measure(x, rest, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        const double      theta = clothi_atan2(h.sine, h.cosine);
        const double      bent = clothi_wrap(theta - rest[CLOTHI_LANES + k]);
        const double      turned = clothi_wrap(theta - start[k]);
        E[k] = 0.5 * rest[k] * bent * bent;
        Ed[k] = 0.5 * rest[k] * damp[k] * turned * turned;
        clothi_fold_force(&h, l[k], rest[k] * (bent + damp[k] * turned), k, f);
    }
}

/* dtheta/dx */
CLOTHI_HOT void clothi_hinge_gradient(clothi_in x, clothi_out f) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_spring_measure(x, x, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, l, k);
        clothi_fold_force(&h, l[k], 1.0, k, f);
    }
}

/* What the second derivative needs, of each wing: p, M, t and (h/l)^2/2; r; and theta and
 * dJ/dtheta, elastic and of damping. */
typedef struct clothi_wings {
    double p[2][3 * CLOTHI_LANES], M[2][3 * CLOTHI_LANES], r[3 * CLOTHI_LANES];
    double t[2][CLOTHI_LANES], bow[2][CLOTHI_LANES], theta[CLOTHI_LANES], moment[CLOTHI_LANES];
} clothi_wings;

CLOTHI_HOT void clothi_hinge_wings(clothi_in x, clothi_in rest, clothi_in start, clothi_in damp,
                                   clothi_wings *CLOTHI_RESTRICT w) {
    double l[CLOTHI_LANES];
    int    k;
    clothi_spring_measure(x, rest, l);
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold         h = clothi_fold_at(x, l, k);
        const clothi_fold_inverse v = clothi_fold_invert(&h);
        const double t1 = h.ae * v.l2, t2 = h.be * v.l2, theta = clothi_atan2(h.sine, h.cosine);
        clothi_vec_put(w->p[0], 0, k, clothi_vec_times(l[k] * v.q1, h.n));
        clothi_vec_put(w->p[1], 0, k, clothi_vec_times(l[k] * v.q2, h.m));
        clothi_vec_put(w->M[0], 0, k, clothi_vec_times(v.l2c * v.q1,
                                                       clothi_vec_plus(h.a, -t1, h.e)));
        clothi_vec_put(w->M[1], 0, k, clothi_vec_times(v.l2c * v.q2,
                                                       clothi_vec_plus(h.b, -t2, h.e)));
        clothi_vec_put(w->r, 0, k, clothi_vec_times(v.l2, h.e));
        w->t[0][k] = t1;
        w->t[1][k] = t2;
        w->bow[0][k] = 0.5 * v.n1 * v.l2 * v.l2;
        w->bow[1][k] = 0.5 * v.n2 * v.l2 * v.l2;
        w->theta[k] = theta;
        w->moment[k] = rest[k] * (clothi_wrap(theta - rest[CLOTHI_LANES + k]) +
                                  damp[k] * clothi_wrap(theta - start[k]));
    }
}

/* H += moment times the second derivative. Corners 2 and 3 have no wing in common. */
CLOTHI_HOT void clothi_hinge_curve(const clothi_wings *CLOTHI_RESTRICT w, clothi_out H) {
    enum { L = CLOTHI_LANES };
    int s, r, c, k;
    for (s = 0; s < 2; s++)
        for (r = 0; r < 3; r++)
            for (c = 0; c < 3; c++) {
                clothi_in  pr = w->p[s] + r * L, pc = w->p[s] + c * L, rr = w->r + r * L;
                clothi_in  Mr = w->M[s] + r * L, Mc = w->M[s] + c * L, rc = w->r + c * L;
                clothi_out h10 = H + (3 * r + c) * L;
                clothi_out h20 = H + (9 * (s ? 3 : 1) + 3 * r + c) * L;
                clothi_out h21 = H + (9 * (s ? 4 : 2) + 3 * r + c) * L;
                for (k = 0; k < L; k++) {
                    const double t = w->t[s][k], pM = pr[k] * Mc[k] + Mr[k] * pc[k];
                    const double m = w->moment[k], rp = rr[k] * pc[k], p_r = pr[k] * rc[k];
                    h10[k] += m * ((t - t * t - w->bow[s][k]) * pM + t * rp - (1.0 - t) * p_r);
                    h20[k] += m * ((t - 1.0) * pM - rp);
                    h21[k] += m * (rp - t * pM);
                }
            }
}

/* H = square times dtheta dtheta', its gradient g. */
CLOTHI_HOT void clothi_hinge_square(clothi_in g, clothi_in square, clothi_out H) {
    enum { L = CLOTHI_LANES };
    int p, r, c, k;
    for (p = 0; p < 6; p++)
        for (r = 0; r < 3; r++)
            for (c = 0; c < 3; c++) {
                clothi_in  a = g + (3 * clothi_pair[p][0] + r) * L;
                clothi_in  b = g + (3 * clothi_pair[p][1] + c) * L;
                clothi_out out = H + (9 * p + 3 * r + c) * L;
                for (k = 0; k < L; k++) out[k] = square[k] * a[k] * b[k];
            }
}

CLOTHI_UNUSED static void clothi_hinge_blocks(clothi_in x, clothi_in was, clothi_in rest,
                                              clothi_in start, clothi_in damp, int psd,
                                              clothi_out H) {
    double       g[12 * CLOTHI_LANES], square[CLOTHI_LANES];
    clothi_wings w;
    int          k;
    (void)was;
    for (k = 0; k < CLOTHI_LANES; k++) square[k] = rest[k] * (1.0 + damp[k]);
    clothi_hinge_gradient(x, g);
    clothi_hinge_square(g, square, H);
    if (psd) return;
    clothi_hinge_wings(x, rest, start, damp, &w);
    clothi_hinge_curve(&w, H);
}

/* H += 'wall': with p = M/2, r = bow = 0 clothi_hinge_curve() adds moment W_i W_j M M'. */
static void clothi_hinge_walls(clothi_in x, clothi_in rest, clothi_in damp, clothi_out H) {
    enum { L = CLOTHI_LANES };
    double       on[2][L];
    clothi_wings w;
    int          i, k, any = 0;
    for (k = 0; k < L; k++) {
        const clothi_fold h = clothi_fold_at(x, clothi_one, k);
        const double      least = CLOTHI_HINGE_FLAT * CLOTHI_HINGE_FLAT * h.l2 * h.l2;
        on[0][k] = clothi_vec_dot(h.n, h.n) < least ? 0.5 : 0.0;
        on[1][k] = clothi_vec_dot(h.m, h.m) < least ? 0.5 : 0.0;
        any |= on[0][k] + on[1][k] > 0.0;
    }
    if (!any) return;
    clothi_hinge_wings(x, rest, clothi_none, clothi_none, &w);
    for (k = 0; k < L; k++) w.moment[k] = CLOTHI_PI * CLOTHI_PI * rest[k] * (1.0 + damp[k]);
    for (i = 0; i < 3 * L; i++)
        for (k = 0; k < 2; k++) w.p[k][i] = on[k][i % L] * w.M[k][i];
    memset(w.r, 0, sizeof w.r);
    memset(w.bow, 0, sizeof w.bow);
    clothi_hinge_curve(&w, H);
}

/* sum_j W_j u_j of wing s */
CLOTHI_LANE clothi_vec clothi_wing_sum(const clothi_wings *w, int s, const double *u, int k) {
    return clothi_vec_plus(clothi_edge(u, 2 + s, k), -w->t[s][k], clothi_edge(u, 1, k));
}

/* What wing s gives: with Wu = sum W_j u_j and Du = u_0 - u_1, W_i a + D_i d to its corners,
 *   a = moment (p (M.Wu) + M (p.Wu) - r (p.Du)) + c (1 + damp) p (p.Wu of both wings),
 *   d = moment ((h/l)^2/2 (p (M.Du) + M (p.Du)) - p (r.Wu)).
 * That of the corner is written to f, those of the edge's ends are added to f0 and f1. */
CLOTHI_LANE void clothi_wing_product(const clothi_wings *w, int s, const double *u, double square,
                                     double along, int k, clothi_vec *f0, clothi_vec *f1,
                                     double *f) {
    const clothi_vec p = clothi_vec_at(w->p[s], 0, k), M = clothi_vec_at(w->M[s], 0, k);
    const clothi_vec r = clothi_vec_at(w->r, 0, k), W = clothi_wing_sum(w, s, u, k);
    const clothi_vec D = clothi_vec_times(-1.0, clothi_edge(u, 1, k));
    const double     pW = clothi_vec_dot(p, W), MW = clothi_vec_dot(M, W);
    const double     pD = clothi_vec_dot(p, D), MD = clothi_vec_dot(M, D), t = w->t[s][k];
    const clothi_vec pM = clothi_vec_plus(clothi_vec_mix(MW, p, pW, M), -pD, r);
    const clothi_vec bow = clothi_vec_times(w->bow[s][k], clothi_vec_mix(MD, p, pD, M));
    const clothi_vec a = clothi_vec_plus(clothi_vec_times(w->moment[k], pM), -along,
                                         clothi_vec_times(square, p));
    const clothi_vec d = clothi_vec_times(w->moment[k],
                                          clothi_vec_plus(bow, -clothi_vec_dot(r, W), p));
    *f0 = clothi_vec_plus(*f0, 1.0, clothi_vec_mix(t - 1.0, a, 1.0, d));
    *f1 = clothi_vec_plus(*f1, -1.0, clothi_vec_mix(t, a, 1.0, d));
    clothi_vec_put(f, 6 + 3 * s, k, a);
}

/* along = dtheta/dx . u */
CLOTHI_HOT void clothi_hinge_products(const clothi_wings *CLOTHI_RESTRICT w, clothi_in u,
                                      clothi_in rest, clothi_in damp, clothi_out along,
                                      clothi_out f) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_vec W0 = clothi_wing_sum(w, 0, u, k), W1 = clothi_wing_sum(w, 1, u, k);
        const double     square = rest[k] * (1.0 + damp[k]);
        const double     both = -(clothi_vec_dot(clothi_vec_at(w->p[0], 0, k), W0) +
                                  clothi_vec_dot(clothi_vec_at(w->p[1], 0, k), W1));
        clothi_vec       f0 = {0, 0, 0}, f1 = {0, 0, 0};
        clothi_wing_product(w, 0, u, square, both, k, &f0, &f1, f);
        clothi_wing_product(w, 1, u, square, both, k, &f0, &f1, f);
        clothi_vec_put(f, 0, k, f0);
        clothi_vec_put(f, 3, k, f1);
        along[k] = both;
    }
}

/* V = c ((theta - theta0) + s (theta - theta_n)) (dtheta/dx . a) */
CLOTHI_UNUSED static void clothi_hinge_vjp(clothi_in x, clothi_in x_n, clothi_in a,
                                           clothi_in rest, clothi_in damp, clothi_out d_rest,
                                           clothi_out d_damp, clothi_out d_x_n, clothi_out Ha) {
    enum { L = CLOTHI_LANES };
    double       start[L] = {0}, along[L];
    clothi_wings w;
    int          i, k;
    if (x_n != x) clothi_hinge_measure(x_n, rest, start);
    clothi_hinge_wings(x, rest, start, damp, &w);
    clothi_hinge_products(&w, a, rest, damp, along, Ha);
    for (k = 0; k < L; k++) {
        const double turned = clothi_wrap(w.theta[k] - start[k]);
        d_rest[k] = (clothi_wrap(w.theta[k] - rest[L + k]) + damp[k] * turned) * along[k];
        d_rest[L + k] = -rest[k] * along[k];
        d_damp[k] = rest[k] * turned * along[k];
    }
    if (x_n == x) return;
    clothi_hinge_gradient(x_n, d_x_n);
    for (i = 0; i < 12 * L; i++) d_x_n[i] *= -rest[i % L] * damp[i % L] * along[i % L];
}

CLOTHI_RARE_BEGIN

CLOTH_API double cloth_hinge_coefficient(double D, double e2, double A1, double A2) {
    const double area = A1 + A2;
    const double c = area > 0.0 ? D * e2 / area : 0.0;
    return clothi_finite(c) ? c : CLOTHI_HUGE;
}

CLOTH_API double cloth_dihedral_hess(const double *x, double *grad, double *hess) {
    double y[12 * CLOTHI_LANES], f[12 * CLOTHI_LANES], theta[CLOTHI_LANES], scale = 1.0;
    const double big = clothi_max_abs(x, 12);
    int    i, exponent;
    if (big > 1e20 || (big < 1e-20 && big > 0.0)) {
        (void)frexp(big, &exponent);
        scale = ldexp(1.0, exponent > 1000 ? -1000 : exponent < -1000 ? 1000 : -exponent);
    }
    for (i = 0; i < 12 * CLOTHI_LANES; i++) y[i] = scale * x[i / CLOTHI_LANES];
    clothi_hinge_measure(y, clothi_one, theta);
    if (grad) clothi_hinge_gradient(y, f);
    clothi_from_lanes(f, 12, scale, grad);
    if (hess) {
        double       H[54 * CLOTHI_LANES];
        clothi_wings w;
        clothi_hinge_wings(y, clothi_none, clothi_none, clothi_none, &w);
        memcpy(w.moment, clothi_one, sizeof w.moment);
        memset(H, 0, sizeof H);
        clothi_hinge_curve(&w, H);
        clothi_full_hessian(H, 4, scale * scale, hess);
    }
    return clothi_finite(theta[0]) ? theta[0] : 0.0;
}

CLOTH_API double cloth_dihedral_grad(const double *x, double *grad) {
    return cloth_dihedral_hess(x, grad, NULL);
}

CLOTH_API double cloth_dihedral(const double *x) { return cloth_dihedral_hess(x, NULL, NULL); }

CLOTH_API double cloth_bend(const double *x, double c, double theta0, double *grad, double *hess,
                            int psd) {
    double       dtheta[12];
    int          i;
    const double theta = cloth_dihedral_hess(x, grad || hess ? dtheta : NULL, psd ? NULL : hess);
    const double bent = theta - theta0;
    const double energy = 0.5 * c * bent * bent;
    for (i = 0; hess && i < 144; i++)
        hess[i] = c * (dtheta[i / 12] * dtheta[i % 12] + (psd ? 0.0 : bent * hess[i]));
    for (i = 0; grad && i < 12; i++) grad[i] = c * bent * dtheta[i];
    clothi_settle(grad, 12);
    clothi_settle(hess, 144);
    return clothi_finite(energy) ? energy : CLOTHI_HUGE;
}

/* ===== [6.4] QUADRATIC BENDING =============================================================== */
/*
 *   near the flat state   theta = |sum_i w_i x_i| for small angles, so the angle need not be
 *                         computed at all: one weighted sum of the four corners             [BWH06]
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
 *             lanes_quadratic, lanes_products
 */
CLOTHI_RARE_END

/* --- x [12][8], rest [5][8] = c, w0 .. w3; start [3][8] = r^n --- */

/* r = sum_i w_i x_i, from the edges: far from the origin digits survive. */
CLOTHI_LANE clothi_vec clothi_quadratic_at(const double *x, const double *rest, int k) {
    enum { L = CLOTHI_LANES };
    const clothi_vec r = clothi_vec_mix(rest[2 * L + k], clothi_edge(x, 1, k), rest[3 * L + k],
                                        clothi_edge(x, 2, k));
    return clothi_vec_plus(r, rest[4 * L + k], clothi_edge(x, 3, k));
}

CLOTHI_HOT void clothi_quadratic_measure(clothi_in x, clothi_in rest, clothi_out r) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) clothi_vec_put(r, 0, k, clothi_quadratic_at(x, rest, k));
}

CLOTHI_HOT void clothi_quadratic_lanes(clothi_in x, clothi_in rest, clothi_in start,
                                       clothi_in damp, clothi_out E, clothi_out Ed, clothi_out f) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_vec r = clothi_quadratic_at(x, rest, k);
        const clothi_vec since = clothi_vec_plus(r, -1.0, clothi_vec_at(start, 0, k));
        const clothi_vec pull = clothi_vec_times(rest[k], clothi_vec_plus(r, damp[k], since));
        E[k] = clothi_vec_dot(clothi_vec_times(0.5 * rest[k], r), r);
        Ed[k] = clothi_vec_dot(clothi_vec_times(0.5 * rest[k] * damp[k], since), since);
        clothi_vec_put(f, 0, k, clothi_vec_times(rest[L + k], pull));
        clothi_vec_put(f, 3, k, clothi_vec_times(rest[2 * L + k], pull));
        clothi_vec_put(f, 6, k, clothi_vec_times(rest[3 * L + k], pull));
        clothi_vec_put(f, 9, k, clothi_vec_times(rest[4 * L + k], pull));
    }
}

/* c (1 + damp) w_i w_j times the 3x3 identity; x, was, start and psd do not matter. */
CLOTHI_HOT void clothi_quadratic_blocks(clothi_in x, clothi_in was, clothi_in rest, clothi_in start,
                                        clothi_in damp, int psd, clothi_out H) {
    enum { L = CLOTHI_LANES };
    int p, q, k;
    (void)x, (void)was, (void)start, (void)psd;
    for (p = 0; p < 6; p++)
        for (q = 0; q < 9; q++)
            for (k = 0; k < L; k++)
                H[(9 * p + q) * L + k] = q % 4 ? 0.0
                                               : rest[k] * rest[(1 + clothi_pair[p][0]) * L + k]
                                                     * rest[(1 + clothi_pair[p][1]) * L + k]
                                                     * (1.0 + damp[k]);
}

/* V = c (r + s (r - r_n)).r_a, r_a = sum w_i a_i. dV/dw is up to a constant, the same for all w,
 * whose sum stays 0. */
CLOTHI_HOT void clothi_quadratic_vjp(clothi_in x, clothi_in x_n, clothi_in a, clothi_in rest,
                                     clothi_in damp, clothi_out d_rest, clothi_out d_damp,
                                     clothi_out d_x_n, clothi_out Ha) {
    enum { L = CLOTHI_LANES };
    double E[L], Ed[L];
    int    i, k;
    clothi_quadratic_lanes(a, rest, clothi_none, damp, E, Ed, Ha);      /* linear in x */
    for (k = 0; k < L; k++) {
        const clothi_vec r = clothi_quadratic_at(x, rest, k);
        const clothi_vec since = clothi_vec_plus(r, -1.0, clothi_quadratic_at(x_n, rest, k));
        const clothi_vec all = clothi_vec_plus(r, damp[k], since);
        const clothi_vec ra = clothi_quadratic_at(a, rest, k);
        const double     c = rest[k];
        d_rest[k] = clothi_vec_dot(all, ra);
        d_damp[k] = clothi_vec_dot(clothi_vec_times(c, since), ra);
        for (i = 0; i < 4; i++) {
            const clothi_vec d = clothi_vec_mix(1.0 + damp[k], clothi_edge(x, i, k), -damp[k],
                                                clothi_edge(x_n, i, k)), da = clothi_edge(a, i, k);
            d_rest[(1 + i) * L + k] = c * (d.x * ra.x + all.x * da.x) +
                                      c * (d.y * ra.y + all.y * da.y) +
                                      c * (d.z * ra.z + all.z * da.z);
            clothi_vec_put(d_x_n, 3 * i, k,
                           clothi_vec_times(-damp[k] * c * rest[(1 + i) * L + k], ra));
        }
    }
}

CLOTHI_RARE_BEGIN

/* What wing k, of height 1/q and foot t, adds to the weights. */
static void clothi_quadratic_wing(double q, double t, int k, double *w) {
    w[0] += (1.0 - t) * q;
    w[1] += t * q;
    w[2 + k] = -q;
}

CLOTH_API void cloth_bend_quadratic_weights(const double *x_rest, double *w) {
    double e[3], l2;
    int    k, flat = 0;
    clothi_sub3(x_rest + 3, x_rest, e);
    l2 = clothi_dot3(e, e);
    memset(w, 0, 4 * sizeof *w);
    for (k = 0; k < 2; k++) {
        double a[3], n[3], q;
        clothi_sub3(x_rest + 6 + 3 * k, x_rest, a);
        clothi_cross3(e, a, n);
        q = 1.0 / sqrt(clothi_dot3(n, n) / l2);
        flat |= !(l2 > 0.0 && q > 0.0 && clothi_finite(q));
        if (!flat) clothi_quadratic_wing(q, clothi_dot3(a, e) / l2, k, w);
    }
    if (flat) memset(w, 0, 4 * sizeof *w);
    clothi_settle(w, 4);
}

/* --- the four kinds --- */

typedef struct clothi_kind {
    int corners, nrest, nmeasure;
    void (*measure)(clothi_in x, clothi_in rest, clothi_out q);
    void (*lanes)(clothi_in x, clothi_in rest, clothi_in start, clothi_in damp, clothi_out E,
                  clothi_out Ed, clothi_out f);
    void (*blocks)(clothi_in x, clothi_in was, clothi_in rest, clothi_in start, clothi_in damp,
                   int psd, clothi_out H);
    void (*vjp)(clothi_in x, clothi_in x_n, clothi_in a, clothi_in rest, clothi_in damp,
                clothi_out d_rest, clothi_out d_damp, clothi_out d_x_n, clothi_out Ha);
} clothi_kind;

static const clothi_kind clothi_kinds[4] = {
    {2, 2, 1, clothi_spring_measure, clothi_spring_lanes, clothi_spring_blocks, clothi_spring_vjp},
    {3, 7, 3, clothi_stretch_measure, clothi_stretch_lanes, clothi_stretch_blocks,
     clothi_stretch_vjp},
    {4, 2, 1, clothi_hinge_measure, clothi_hinge_lanes, clothi_hinge_blocks, clothi_hinge_vjp},
    {4, 5, 3, clothi_quadratic_measure, clothi_quadratic_lanes, clothi_quadratic_blocks,
     clothi_quadratic_vjp}};

/* --- one element of a kind with an energy in `rest` alone: the same in all lanes --- */

static double clothi_one_element(int kind, const double *x, const double *rest, double *grad,
                                 double *hess, int psd) {
    const clothi_kind *q = clothi_kinds + kind;
    double y[12 * CLOTHI_LANES], r[7 * CLOTHI_LANES], f[12 * CLOTHI_LANES], H[54 * CLOTHI_LANES];
    double E[CLOTHI_LANES], Ed[CLOTHI_LANES];
    clothi_to_lanes(x, 3 * q->corners, y);
    clothi_to_lanes(rest, q->nrest, r);
    q->lanes(y, r, clothi_none, clothi_none, E, Ed, f);
    clothi_from_lanes(f, 3 * q->corners, 1.0, grad);
    if (hess) {
        q->blocks(y, y, r, clothi_none, clothi_none, psd, H);
        clothi_full_hessian(H, q->corners, 1.0, hess);
    }
    return clothi_finite(E[0]) ? E[0] : CLOTHI_HUGE;
}

CLOTH_API double cloth_spring(const double *x, double rest_length, double k, double *grad,
                              double *hess, int psd) {
    const double rest[2] = {k, rest_length};
    return clothi_one_element(CLOTHI_SPRING, x, rest, grad, hess, psd);
}

CLOTH_API double cloth_stretch(const double *x, const double *X, double mu, double lambda,
                               double *grad, double *hess, int psd) {
    double B[7];
    B[4] = clothi_rest_inverse(X, B), B[5] = mu, B[6] = lambda;
    return clothi_one_element(CLOTHI_TRIANGLE, x, B, grad, hess, psd != 0);
}

CLOTH_API double cloth_bend_quadratic(const double *x, const double *w, double c, double *grad,
                                      double *hess) {
    const double rest[5] = {c, w[0], w[1], w[2], w[3]};
    return clothi_one_element(CLOTHI_QUADRATIC, x, rest, grad, hess, 0);
}

CLOTHI_RARE_END

/* ===== [6.5] STRETCH AND BENDING IN ONE =======================================================
 *
 * The explicit step's path: forces of triangles that have those of their hinges in them. A hinge's
 * gradient has a part in each of its two triangles, along that triangle's normal n. With
 * the pull m = (dJ/dtheta)/l of each edge (m_k: of the one opposite corner k, 0 at a boundary) and
 * a_k the dot product of the two edges at corner k, so that a foot is t = a/l^2, l_i^2 = a_j + a_k,
 * [6.3] reads   G_i = n/|n|^2 [ a_k (m_j - m_i) + a_j (m_k - m_i) ],   i, j, k the three corners.
 * Quadratic bending has the pull M = c sum_i w_i x_i, a vector, and G_i = P g_i with the 3x2
 * matrix P = sum_k M_k u_k', u_k = g_k/|g_k| across edge k (g: [6.2]): one more stress.
 * Hence a number (or vector) per hinge and 9 numbers per triangle instead of 12 more per hinge, and
 * a vertex sums 6 corners, not 18.
 * The edges' dot products give the stretch as well: C = Ds'Ds, at rest C0 = (BB')^-1, S' =
 * A B S B' is linear in C - C0, and the gradients are those of [6.2], (A F S g_1, A F S g_2) =
 * Ds S'. Rounding grows with the square of a sliver's aspect, in [6.2] with the aspect.
 *
 *   pull      of hinges [8], of quadratic ones [8][3]; a triangle's [3][8], quadratic [9][8]
 *   side      of hinges [9][8]: C0 (11, 22, 12), then S' = (K0 K1 2 K3; K1 K2 2 K4; K3 K4 K5)(C-C0)
 *             on (11, 22, 12); quadratic [6][8]: u_0, u_1, u_2
 *   collapse  |n| is not taken smaller than 1e-6 of the triangle's own sum of a_k (in [6.3]: of the
 *             hinge's sum of squares)
 *   checked   tests/test_leapfrog.c: triangle_forces
 */

/* M/l where all eight hinges are flat at rest and below 22 degrees: with w = tan(theta) = l y/x,
 * atan(w)/l = (y/x) (atan(w)/w), an even function of w, so neither a root nor octants. */
CLOTHI_HOT void clothi_shallow_pulls(clothi_in rest, clothi_in l2, clothi_in y, clothi_in x,
                                     clothi_out pull) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const double slope = y[k] / x[k];
        pull[k] = rest[k] * (slope + slope * clothi_atan_tail(l2[k] * slope * slope));
    }
}

CLOTHI_HOT void clothi_steep_pulls(clothi_in rest, clothi_in l, clothi_in y, clothi_in x,
                                   clothi_out pull) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const double angle = clothi_atan2(l[k] * y[k], x[k]);
        pull[k] = rest[k] * clothi_wrap(angle - rest[CLOTHI_LANES + k]) / (l[k] + 1e-30);
    }
}

/* theta = atan2(l y, x) and l^2. */
CLOTHI_HOT void clothi_hinge_folds(clothi_in x, clothi_out l2, clothi_out sine, clothi_out cosine) {
    int k;
    for (k = 0; k < CLOTHI_LANES; k++) {
        const clothi_fold h = clothi_fold_at(x, clothi_one, k);
        l2[k] = h.l2;
        sine[k] = h.sine;
        cosine[k] = h.cosine;
    }
}

CLOTHI_UNUSED static void clothi_hinge_pulls(const double *x, const double *rest, double *pull) {
    double l[CLOTHI_LANES], sine[CLOTHI_LANES], cosine[CLOTHI_LANES];
    int    k, shallow = 1;
    clothi_hinge_folds(x, l, sine, cosine);
    for (k = 0; k < CLOTHI_LANES; k++)
        shallow &= l[k] * sine[k] * sine[k] <= 0.17 * cosine[k] * cosine[k] && cosine[k] > 1e-150 &&
                   !(fabs(rest[CLOTHI_LANES + k]) > 0);
    if (shallow) {
        clothi_shallow_pulls(rest, l, sine, cosine, pull);
        return;
    }
    clothi_sqrt_lanes(l);
    clothi_steep_pulls(rest, l, sine, cosine, pull);
}

CLOTHI_HOT void clothi_quadratic_pulls(clothi_in x, clothi_in rest, clothi_out pull) {
    double r[3 * CLOTHI_LANES];
    int    k;
    clothi_quadratic_measure(x, rest, r);
    for (k = 0; k < CLOTHI_LANES; k++) {
        pull[3 * k] = -rest[k] * r[k];
        pull[3 * k + 1] = -rest[k] * r[CLOTHI_LANES + k];
        pull[3 * k + 2] = -rest[k] * r[2 * CLOTHI_LANES + k];
    }
}

CLOTHI_HOT void clothi_winged_hinge(clothi_in x, clothi_in side, clothi_in pull, clothi_out f) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_vec d = clothi_edge(x, 1, k), h = clothi_edge(x, 2, k);
        const clothi_vec g = clothi_vec_plus(h, -1.0, d), n = clothi_vec_cross(d, h);
        const double a0 = clothi_vec_dot(d, h), a1 = -clothi_vec_dot(d, g);
        const double a2 = clothi_vec_dot(g, h), s = a0 + a1 + a2, q = clothi_vec_dot(n, n);
        const double qf = CLOTHI_HINGE_FLOOR * s * s + CLOTHI_HINGE_TINY_Q;
        const double inv = 1.0 / (q > qf ? q : qf);
        const double m01 = pull[k] - pull[L + k], m12 = pull[L + k] - pull[2 * L + k];
        const double m02 = pull[k] - pull[2 * L + k];
        const double c1 = inv * (a2 * m01 - a0 * m12), c2 = inv * (a0 * m12 + a1 * m02);
        const double u = a0 + a1 - side[k], v = a0 + a2 - side[L + k], w = a0 - side[2 * L + k];
        const double p = side[6 * L + k], r = side[7 * L + k], z = side[8 * L + k];
        const double s1 = side[3 * L + k] * u + side[4 * L + k] * v + p * (w + w);
        const double s2 = side[4 * L + k] * u + side[5 * L + k] * v + r * (w + w);
        const double s12 = p * u + r * v + z * w;
        clothi_tri_put(f, k, clothi_vec_plus(clothi_vec_mix(s1, d, s12, h), c1, n),
                       clothi_vec_plus(clothi_vec_mix(s12, d, s2, h), c2, n));
    }
}

/* sum_i M_i (u_i)_axis, M = pull */
CLOTHI_LANE clothi_vec clothi_winged_pull(const double *pull, const double *side, int axis,
                                          int k) {
    enum { L = CLOTHI_LANES };
    const clothi_vec m = clothi_vec_mix(side[axis * L + k], clothi_vec_at(pull, 0, k),
                                        side[(2 + axis) * L + k], clothi_vec_at(pull, 3, k));
    return clothi_vec_plus(m, side[(4 + axis) * L + k], clothi_vec_at(pull, 6, k));
}

CLOTHI_HOT void clothi_winged_quadratic(clothi_in x, clothi_in rest, clothi_in pull, clothi_in side,
                                        clothi_out f) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L; k++) {
        const clothi_tri t = clothi_tri_at(x, rest, k);
        const clothi_vec s = clothi_tri_stress(t.E, rest, k);
        const clothi_vec p = clothi_vec_plus(clothi_vec_mix(s.x, t.F1, s.z, t.F2), 1.0,
                                             clothi_winged_pull(pull, side, 0, k));
        const clothi_vec q = clothi_vec_plus(clothi_vec_mix(s.z, t.F1, s.y, t.F2), 1.0,
                                             clothi_winged_pull(pull, side, 1, k));
        clothi_tri_put(f, k, clothi_vec_mix(rest[k], p, rest[L + k], q),
                       clothi_vec_mix(rest[2 * L + k], p, rest[3 * L + k], q));
    }
}

CLOTHI_RARE_BEGIN

/* ===== [7.1] ORDERING ==========================================================================
 *
 *   vertices of the mesh ---> rows of the matrix           subdomains 0..3    separators S
 *
 *        +-----+--+-----+      subdomain 0 |X          x|   A row of a subdomain only couples
 *        |  0  |  |  1  |                1 |   X       x|   with rows of its own and of S, so
 *        |     |S1|     |                2 |      X    x|   that Gauss-Seidel sweeps, products
 *        +--S2-+  +-S3--+                3 |         X x|   and the assembly run subdomain by
 *        |  2  |  |  3  |                S |x  x  x   X |   subdomain, side by side, with the
 *        +-----+--+-----+                  +------------+   same numbers for any worker count.
 *
 *   dissection  a part is sorted along the longest side of the box around it (without positions:
 *               by graph distance from a vertex at its rim) and cut in the middle; of the two
 *               sides of the cut the one with fewer vertices at it gives them to the separator.
 *               Its first parts are the subdomains, 1 below CLOTHI_ONE_DOMAIN vertices, 4, 8 from
 *               CLOTHI_EIGHT_DOMAINS on; it goes on, down to some 24 vertices, and [7.4]
 *               eliminates along its tree.
 *   strips      the blocks of one row in the columns of one subdomain, or of S. Strips of subdomain
 *               0 come first: those of its rows, then those of all rows of S; S in S comes last.
 *               What works on the columns of a subdomain goes through its strips, in one loop.
 *   aggregates  nv/85 (4 to 512) seeds, each the farthest from those before it in graph distance;
 *               a vertex joins its nearest seed. They carry the coarse space of [7.3]. Vertices
 *               that no seed reaches (more than 512 pieces) have none. Numbered as a front that
 *               sweeps along the mesh meets them, neighbours get near numbers, and the coarse
 *               matrix is a band.
 *
 * checked: tests/test_sparse.c (order, domains, star, pieces); what was tried and lost is in
 *          tests/bench/bench_linear.c
 */

#define CLOTHI_ONE_DOMAIN    500            /* vertices; below: one domain, no parallel calls  */
#define CLOTHI_EIGHT_DOMAINS 16384
#define CLOTHI_DOMAINS       8              /* at most                                         */
#define CLOTHI_PART_SIZE     24             /* vertices of the smallest part that is still cut */
#define CLOTHI_AGG_VERTICES  85             /* per aggregate                                   */
#define CLOTHI_AGG_MIN       4
#define CLOTHI_AGG_MAX       512

/* One part of the dissection: verts[lo, hi) are its vertices, verts[mid, hi) the separator that
 * parts its children (mid == lo in a leaf of the tree). */
typedef struct clothi_part {
    int lo, mid, hi;
    int parent, child[2];                   /* -1: none                                        */
    int domain;                             /* of its subdomain, -1: a separator above them    */
} clothi_part;

struct cloth_pattern {
    cloth_hooks hooks;
    int  *row_of;                           /* [n] of a vertex; the block of vertex_of, own, agg,
                                               vp and verts too                                */
    int  *col;                              /* [nlow] increasing in a strip; and of row, start */
    int  *vj;                               /* aggregates coupled to a row; and of envelope    */
    clothi_part *part;                      /* in post-order: children before parents          */
    int   n, nlow, nparts;                  /* rows; blocks strictly below the diagonal; parts */
    int   nd;                               /* subdomains                                      */
    int   dom[CLOTHI_DOMAINS + 2];          /* rows of d: [dom[d], dom[d+1]); last: S          */
    int  *vertex_of;                        /* [n] of a row                                    */
    int   strip[CLOTHI_DOMAINS + 2];        /* of d: [strip[d], strip[d+1]); last: of S        */
    int  *own;                              /* [n] of a row: the strip in its own columns      */
    int  *row;                              /* [strip[nd+1]] of a strip                        */
    int  *start;                            /* [strip[nd+1] + 1] where strips begin in col     */
    int   nc;                               /* aggregates                                      */
    int  *agg;                              /* [n] of a row, or -1                             */
    int  *vp;                               /* [n+1] where rows begin in vj: aggregates from the
                                               diagonal on, their own first                    */
    int  *envelope;                         /* [nc] row a of the coarse matrix ends there      */
    int  *verts;                            /* [n] vertices in the order of elimination        */
};

typedef struct clothi_graph {               /* neighbours of each vertex, increasing           */
    int *start, *to;
} clothi_graph;

/* Neighbours by elements: each vertex, in increasing order, joins once the lists of all that it
 * shares an element with. */
static cloth_status clothi_graph_build(const cloth_hooks *hooks, int nv, int nelem,
                                       const int *start, const int *vertex, clothi_graph *g) {
    const int base = nelem > 0 ? start[0] : 0, n = nelem > 0 ? start[nelem] - base : 0;
    int       pass, e, v, i, k, *owner, *order, *first, *last;
    double    pairs = 0;
    for (e = 0; e < nelem; e++)
        pairs += (double)(start[e + 1] - start[e]) * (double)(start[e + 1] - start[e]);
    if (pairs > 2e9)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "pattern: nelem = %i elements join %g pairs,"
                           " at most 2e9", nelem, pairs);
    owner = (int *)clothi_alloc(hooks, 2 * (size_t)n + 2 * (size_t)nv + 1, sizeof(int));
    g->start = (int *)clothi_alloc(hooks, (size_t)nv + 2, sizeof(int));
    if (!owner || !g->start) goto done;
    order = owner + n, first = order + n, last = first + nv + 1;
    for (e = 0; e < nelem; e++)
        for (k = start[e]; k < start[e + 1]; k++) owner[k - base] = e;
    clothi_sort_by(n, nv, n ? vertex + base : NULL, NULL, order, first);
    for (pass = 0; pass < 2; pass++) {      /* count, then list                                */
        memset(last, 255, (size_t)nv * sizeof(int));
        for (v = 0; v < nv; v++)
            for (k = first[v]; k < first[v + 1]; k++)
                for (e = owner[order[k]], i = start[e]; i < start[e + 1]; i++) {
                    const int u = vertex[i];
                    if (u == v || last[u] == v) continue;
                    last[u] = v;
                    if (pass) g->to[g->start[u + 1]++] = v;
                    else g->start[u + 2]++;
                }
        if (pass) break;
        for (v = 0; v < nv; v++) g->start[v + 2] += g->start[v + 1];
        g->to = (int *)clothi_alloc(hooks, (size_t)g->start[nv + 1], sizeof(int));
        if (!g->to) break;
    }
done:
    clothi_free(hooks, owner);
    return g->to ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

/* A quicksort would be shorter, but equal keys must come out in one order on every machine:
 * merges are stable. Sorts index [n] by (key[index], position); tmp [n]. */
static void clothi_sort(int *index, int *tmp, int n, const double *key) {
    int *from = index, *to = tmp, *swap;
    int  width, lo;
    for (width = 1; width < n; width = width > n / 2 ? n : 2 * width) {
        for (lo = 0; lo < n; ) {
            int mid = n - lo > width ? lo + width : n;
            int hi = n - mid > width ? mid + width : n;
            int i = lo, j = mid, k = lo;
            while (i < mid && j < hi) to[k++] = key[from[j]] < key[from[i]] ? from[j++] : from[i++];
            while (i < mid) to[k++] = from[i++];
            while (j < hi) to[k++] = from[j++];
            lo = hi;
        }
        swap = from, from = to, to = swap;
    }
    if (from != index) memcpy(index, from, (size_t)n * sizeof *index);
}

/* The first of list[low .. high), increasing, that is not below key; high: none. */
CLOTHI_OUTLINE static int clothi_lower_bound(const int *list, int low, int high, int key) {
    while (low < high) {
        const int mid = low + (high - low) / 2;
        if (list[mid] < key) low = mid + 1;
        else high = mid;
    }
    return low;
}

/* --- dissection --- */

typedef struct clothi_dissection {
    int           nparts;
    int           next;                     /* the first part that was not looked at yet       */
    const clothi_graph *g;
    const double *coords;                   /* [nv x 3] or NULL                                */
    int          *verts;                    /* [nv] those of the pattern                       */
    double       *key;                      /* [nv]                                            */
    int          *tmp, *tag, *dist;         /* [nv] each and one more, behind key              */
    clothi_part  *part;                     /* [2 nv] parents before children                  */
} clothi_dissection;

#define CLOTHI_FAR 0x3fffffff               /* graph distance of what no walk has reached      */

/* Breadth first from seed over vertices with its tag: dist is lowered, and owner (or NULL) becomes
 * name, where the seed is nearer than what was there. Returns the last vertex that it reaches. */
static int clothi_spread(const clothi_graph *g, const int *tag, int seed, int *dist, int *owner,
                         int name, int *queue) {
    int head = 0, tail = 0, k;
    dist[seed] = 0;
    if (owner) owner[seed] = name;
    queue[tail++] = seed;
    for (; head < tail; head++) {
        const int v = queue[head];
        for (k = g->start[v]; k < g->start[v + 1]; k++) {
            const int u = g->to[k];
            if (tag[u] != tag[seed] || dist[u] <= dist[v] + 1) continue;
            dist[u] = dist[v] + 1;
            if (owner) owner[u] = name;
            queue[tail++] = u;
        }
    }
    return queue[tail - 1];
}

/* Sorts verts[0, n), all of one tag, along the part: by its longest coordinate axis, or without
 * coordinates by graph distance from a vertex at its rim. */
static void clothi_dissect_sort(clothi_dissection *d, int *verts, int n) {
    double lo[3], hi[3];
    int    axis = 0, seed = verts[0], i, k;
    for (k = 0; k < 3 && d->coords; k++) {
        lo[k] = hi[k] = d->coords[3 * (size_t)verts[0] + (size_t)k];
        for (i = 1; i < n; i++) {
            const double c = d->coords[3 * (size_t)verts[i] + (size_t)k];
            lo[k] = clothi_min(c, lo[k]), hi[k] = clothi_max(c, hi[k]);
        }
        if (hi[k] - lo[k] > hi[axis] - lo[axis]) axis = k;
    }
    for (k = 0; k < 2 && !d->coords; k++) {
        for (i = 0; i < n; i++) d->dist[verts[i]] = CLOTHI_FAR;
        seed = clothi_spread(d->g, d->tag, seed, d->dist, NULL, 0, d->tmp);
    }
    for (i = 0; i < n; i++)
        d->key[verts[i]] = d->coords ? d->coords[3 * (size_t)verts[i] + (size_t)axis]
                                     : d->dist[verts[i]];
    clothi_sort(verts, d->tmp, n, d->key);
}

/* True when a neighbour of v carries tag t. */
static int clothi_dissect_touches(const clothi_dissection *d, int v, int t) {
    int k;
    for (k = d->g->start[v]; k < d->g->start[v + 1]; k++)
        if (d->tag[d->g->to[k]] == t) return 1;
    return 0;
}

/* Halves part id and makes the rim of one half its separator. A clique stays whole. */
static void clothi_dissect_part(clothi_dissection *d, int id) {
    clothi_part *p = d->part + id;
    int *verts = d->verts + p->lo;
    int  n = p->hi - p->lo, half = n / 2, t = 2 * id + 1;
    int  rim[2] = {0, 0}, at[3], side, i, k;
    for (i = 0; i < n; i++) d->tag[verts[i]] = t;
    clothi_dissect_sort(d, verts, n);
    for (i = half; i < n; i++) d->tag[verts[i]] = t + 1;
    for (i = 0; i < n; i++) rim[i >= half] += clothi_dissect_touches(d, verts[i], t + (i < half));
    side = rim[1] < rim[0];
    at[0] = 0;
    at[1] = half - (side ? 0 : rim[0]);
    at[2] = n - rim[side];
    if (at[1] == 0 || at[1] == at[2]) return;
    p->mid = p->lo + at[2];
    for (k = 0; k < 2; k++) {
        clothi_part *c = d->part + d->nparts;
        *c = *p;
        c->lo = c->mid = p->lo + at[k];
        c->hi = p->lo + at[k + 1];
        c->parent = id;
        c->child[0] = c->child[1] = -1;
        p->child[k] = d->nparts++;
    }
    for (i = 0; i < n; i++) {
        k = i >= half;
        if (k == side && clothi_dissect_touches(d, verts[i], t + 1 - k)) k = 2;
        d->tmp[at[k]++] = verts[i];
    }
    memcpy(verts, d->tmp, (size_t)n * sizeof *verts);
}

/* Goes on until there are `leaves` parts that are not cut (0: as far as parts can be). Parts are
 * numbered as they are made, so the list is its own work list. */
static void clothi_dissect(clothi_dissection *d, int leaves) {
    for (; d->next < d->nparts && (!leaves || d->nparts < 2 * leaves - 1); d->next++) {
        const clothi_part *p = d->part + d->next;
        if (p->hi - p->lo > CLOTHI_PART_SIZE) clothi_dissect_part(d, d->next);
    }
}

/* Parts into post-order: a subtree ends with its root, and the second child stands just before its
 * parent. From the end on, each takes the next place and tells it its parent and its children. */
static void clothi_pattern_parts(cloth_pattern *p, const clothi_dissection *d) {
    int *stack = d->tmp, top = 0, q, k;
    stack[top++] = 0;
    for (q = p->nparts - 1; q >= 0; q--) {
        const clothi_part *from = d->part + stack[--top];
        const int          parent = from->parent;
        p->part[q] = *from;
        if (parent >= 0) p->part[parent].child[parent == q + 1] = q;
        for (k = 0; k < 2 && from->child[0] >= 0; k++) {
            d->part[from->child[k]].parent = q;
            stack[top++] = from->child[k];
        }
    }
}

/* --- rows --- */

/* Subdomains first, separators last, the earliest cut at the very end. */
static void clothi_pattern_order(cloth_pattern *p, const clothi_dissection *d) {
    int i, id, domain = 0, row = 0;
    for (id = 0; id < d->nparts; id++) {
        clothi_part *q = d->part + id;
        if (q->child[0] >= 0) continue;
        q->domain = domain;
        p->dom[domain++] = row;
        for (i = q->lo; i < q->hi; i++) p->vertex_of[row++] = d->verts[i];
    }
    while (domain <= p->nd) p->dom[domain++] = row;             /* a clique is not cut         */
    for (id = d->nparts - 1; id >= 0; id--)
        for (i = d->part[id].mid; d->part[id].child[0] >= 0 && i < d->part[id].hi; i++)
            p->vertex_of[row++] = d->verts[i];
    p->dom[p->nd + 1] = p->n;
    for (i = 0; i < p->n; i++) p->row_of[p->vertex_of[i]] = i;
    memset(d->tag, 0, (size_t)p->n * sizeof(int));
}

/* Of row i, of S, the strip in the columns of subdomain d. */
CLOTHI_LANE int clothi_shared(const cloth_pattern *p, int d, int i) {
    return p->strip[d + 1] + i - p->n;
}

/* Of row i, the strip that column j < i is in if it couples with it. */
CLOTHI_LANE int clothi_strip(const cloth_pattern *p, int i, int j) {
    int d = 0;
    if (i < p->dom[p->nd] || j >= p->dom[p->nd]) return p->own[i];
    while (j >= p->dom[d + 1]) d++;
    return clothi_shared(p, d, i);
}

/* Strips and their blocks below the diagonal, written column by column, hence increasing. */
static cloth_status clothi_pattern_strips(cloth_pattern *p, const clothi_graph *g) {
    const int first = p->dom[p->nd], strips = p->n + p->nd * (p->n - first);
    int i, j, k, d, q = 0;
    p->nlow = g->start[p->n] / 2;
    p->col = (int *)clothi_alloc(&p->hooks, (size_t)p->nlow + 2 * (size_t)strips + 1, sizeof(int));
    if (!p->col) return CLOTH_ERR_MEMORY;
    p->row = p->col + p->nlow, p->start = p->row + strips;
    for (d = 0; d <= p->nd; d++) {
        for (i = p->dom[d]; i < p->dom[d + 1]; i++) p->own[i] = q, p->row[q++] = i;
        for (i = first; d < p->nd && i < p->n; i++) p->row[q++] = i;
        p->strip[d + 1] = q;
    }
    for (j = 0; j < p->n; j++) {
        const int v = p->vertex_of[j];
        for (k = g->start[v]; k < g->start[v + 1]; k++) {
            i = p->row_of[g->to[k]];
            if (i > j) p->start[clothi_strip(p, i, j)]++;
        }
    }
    for (q = 0; q < strips; q++) p->start[q + 1] += p->start[q];
    for (j = p->n - 1; j >= 0; j--) {       /* from a strip's end back to its start            */
        const int v = p->vertex_of[j];
        for (k = g->start[v]; k < g->start[v + 1]; k++) {
            i = p->row_of[g->to[k]];
            if (i > j) p->col[--p->start[clothi_strip(p, i, j)]] = j;
        }
    }
    return CLOTH_OK;
}

/* --- aggregates --- */

/* Aggregates of the vertices into p->agg: seeds by farthest point, members by distance; renumbered
 * as the vertices along the mesh's longest axis, verts, meet them. */
static void clothi_pattern_aggregates(cloth_pattern *p, const clothi_dissection *d) {
    int i, a, met = 0, seed = d->verts[0], want = p->n / CLOTHI_AGG_VERTICES;
    int name[CLOTHI_AGG_MAX];
    if (want < CLOTHI_AGG_MIN) want = CLOTHI_AGG_MIN;
    if (want > CLOTHI_AGG_MAX) want = CLOTHI_AGG_MAX;
    for (i = 0; i < p->n; i++) d->dist[i] = CLOTHI_FAR, p->agg[i] = -1;
    for (p->nc = 0; p->nc < want && d->dist[seed] > 0; p->nc++) {
        name[p->nc] = -1;
        (void)clothi_spread(d->g, d->tag, seed, d->dist, p->agg, p->nc, d->tmp);
        for (i = 0; i < p->n; i++)
            if (d->dist[i] > d->dist[seed]) seed = i;
    }
    for (i = 0; i < p->n; i++) {
        a = p->agg[d->verts[i]];
        if (a >= 0 && name[a] < 0) name[a] = met++;
    }
    for (i = 0; i < p->n; i++)
        if (p->agg[i] >= 0) p->agg[i] = name[p->agg[i]];
}

/* Place of aggregate a in list [begin, *end), added at the end when new; nothing for a < 0. */
static void clothi_place(int *list, int begin, int *end, int a) {
    int k;
    for (k = begin; k < *end; k++)
        if (list[k] == a) return;
    if (a >= 0) list[(*end)++] = a;
}

/* Aggregates coupled to each row from the diagonal on, and what they couple in the coarse matrix.
 * A row touches few, so that linear searches do; where it touches many (a hub), at most nc. */
static cloth_status clothi_pattern_coarse(cloth_pattern *p, const clothi_graph *g) {
    const size_t most = (size_t)p->n + (size_t)p->nlow;
    int i, j, k, v = 0;
    p->vj = (int *)clothi_alloc(&p->hooks, most + (size_t)p->nc, sizeof(int));
    if (!p->vj) return CLOTH_ERR_MEMORY;
    p->envelope = p->vj + most;
    for (i = 0; i < p->n; i++) {
        const int u = p->vertex_of[i], a = p->agg[i];
        p->vp[i] = v;
        clothi_place(p->vj, v, &v, a);
        for (k = g->start[u]; k < g->start[u + 1]; k++) {
            j = p->row_of[g->to[k]];
            if (j > i) clothi_place(p->vj, p->vp[i], &v, p->agg[j]);
        }
        for (k = p->vp[i]; k < v; k++) {
            const int b = p->vj[k], low = a < b ? a : b;
            if (p->envelope[low] < a + b - low + 1) p->envelope[low] = a + b - low + 1;
        }
    }
    p->vp[p->n] = v;
    return CLOTH_OK;
}

/* --- the pattern --- */

static cloth_status clothi_pattern_check(const cloth_hooks *hooks, int nv, int nelem,
                                         const int *start, const int *vertex) {
    int e;
    if (nv < 1 || nv > CLOTH_MAX_COUNT || nelem < 0 || (nelem > 0 && (!start || !vertex)))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "pattern: nv = %i, nelem = %i, or a list is NULL", nv, nelem);
    if (nelem > 0 && start[0] < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "pattern: start[0] = %i", start[0]);
    for (e = 0; e < nelem; e++)
        if (start[e + 1] < start[e])
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "pattern: start[%i] decreases", e + 1);
    return clothi_check_indices(hooks, CLOTH_ERR_ARGUMENT, "pattern: ", "vertex", vertex,
                                nelem > 0 ? start[nelem] : 0, 1, nv);
}

/* Everything that p holds, from the graph. Aggregates are found by vertex, kept by row. */
static cloth_status clothi_pattern_fill(cloth_pattern *p, clothi_dissection *d) {
    cloth_status status;
    int          i;
    for (i = 0; i < p->n; i++) d->verts[i] = i;
    d->part[0].hi = p->n, d->nparts = 1;
    d->part[0].parent = d->part[0].child[0] = d->part[0].child[1] = d->part[0].domain = -1;
    clothi_dissect_sort(d, d->verts, p->n);     /* all vertices along the longest axis         */
    clothi_pattern_aggregates(p, d);
    clothi_dissect(d, p->nd);
    clothi_pattern_order(p, d);
    memcpy(d->dist, p->agg, (size_t)p->n * sizeof(int));
    for (i = 0; i < p->n; i++) p->agg[i] = d->dist[p->vertex_of[i]];
    clothi_dissect(d, 0);
    p->nparts = d->nparts;
    p->part = (clothi_part *)clothi_alloc(&p->hooks, (size_t)p->nparts, sizeof *p->part);
    if (!p->part) return CLOTH_ERR_MEMORY;
    clothi_pattern_parts(p, d);
    status = clothi_pattern_strips(p, d->g);
    return status ? status : clothi_pattern_coarse(p, d->g);
}

CLOTH_API cloth_status cloth_pattern_create(const cloth_hooks *hooks, int nv, int nelem,
                                            const int *start, const int *vertex, const double *x,
                                            cloth_pattern **out) {
    cloth_pattern *p = NULL;
    cloth_status   status;
    clothi_graph   g;
    clothi_dissection d;
    const size_t   n = (size_t)nv;
    memset(&d, 0, sizeof d);
    if (!out) return CLOTH_ERR_ARGUMENT;
    *out = NULL;
    g.start = g.to = NULL;
    status = clothi_pattern_check(hooks, nv, nelem, start, vertex);
    if (!status) status = clothi_graph_build(hooks, nv, nelem, start, vertex, &g);
    if (status) goto done;
    status = CLOTH_ERR_MEMORY;
    p = (cloth_pattern *)clothi_object(hooks, sizeof *p);
    if (p) p->row_of = (int *)clothi_alloc(hooks, 6 * n + 1, sizeof(int));
    d.key = (double *)clothi_alloc(hooks, 3 * n, sizeof(double));
    d.part = (clothi_part *)clothi_alloc(hooks, 2 * n, sizeof *d.part);
    if (!p || !p->row_of || !d.key || !d.part) goto done;
    p->n = nv;
    p->nd = nv < CLOTHI_ONE_DOMAIN ? 1 : nv < CLOTHI_EIGHT_DOMAINS ? 4 : 8;
    p->vertex_of = p->row_of + n, p->agg = p->vertex_of + n, p->verts = p->agg + n;
    p->own = p->verts + n, p->vp = p->own + n;
    d.g = &g, d.coords = x, d.verts = p->verts;
    d.tmp = (int *)(d.key + n), d.tag = d.tmp + n, d.dist = d.tag + n;
    status = clothi_pattern_fill(p, &d);
done:
    clothi_free(hooks, d.key);
    clothi_free(hooks, d.part);
    clothi_free(hooks, g.start);
    clothi_free(hooks, g.to);
    if (status) cloth_pattern_destroy(p);
    else *out = p;
    return status;
}

CLOTH_API void cloth_pattern_destroy(cloth_pattern *pattern) {
    (void)clothi_object_blocks(pattern, 4, 1);
}

CLOTH_API size_t cloth_pattern_bytes(const cloth_pattern *pattern) {
    return clothi_object_blocks(pattern, 4, 0);
}

/* The leaf of a vertex, or -1 for one of a separator. */
static int clothi_pattern_domain(const cloth_pattern *pattern, int vertex) {
    int d, r = pattern->row_of[vertex];
    for (d = 0; d < pattern->nd; d++)
        if (r < pattern->dom[d + 1]) return d;
    return -1;
}

/* Block (i, j), i != j: 2 k + t, block k below the diagonal, t = 1: it is the transposed that is
 * stored; -1: not in the pattern. O(log of the row). */
static int clothi_pattern_slot(const cloth_pattern *pattern, int i, int j) {
    const int a = pattern->row_of[i], b = pattern->row_of[j], turned = a < b;
    const int row = turned ? b : a, col = turned ? a : b;
    const int q = clothi_strip(pattern, row, col), end = pattern->start[q + 1];
    const int at = clothi_lower_bound(pattern->col, pattern->start[q], end, col);
    return at < end && pattern->col[at] == col ? 2 * at + turned : -1;
}

/* ===== [7.2] BLOCK SPARSE MATRIX ===============================================================
 *
 *   A = | D0        sym |     values    D0 D1 ... D(n-1)  then the blocks below the diagonal,
 *       | A10 D1        |               strip by strip [7.1], each [3x3] doubles: one array, so
 *       |     A21 D2    |               that assembly walks it nearly in order
 *       | A30     A32 D3|     slot      2 k + t of a pair (i, j): block k, t = 1 when it is stored
 *                                       transposed, because row(i) < row(j)
 *   extras  pairs outside the pattern (a host's term, a contact): a list of (row, column, block), a
 *           pair once, by a hash table, until the matrix is cleared. It keeps its size. Operator,
 *           coarse space and the curvature tests of [7.3] see it; Gauss-Seidel sweeps do not.
 *   panels  columns of a dense factor L S L', S = diag(+-1): a few are factored one by one, then
 *           their product is taken off what is to their right, tile by tile. So are the coarse
 *           matrix of [7.3] and the fronts of [7.4].
 *
 * checked: tests/test_sparse.c (mul, extras, memory)
 */

struct cloth_matrix {
    cloth_hooks hooks;
    double *diag;                           /* [n x 9]; the block of low and one spare too     */
    double *extra;                          /* [ne x 9]; and of pair and table                 */
    const cloth_pattern *p;
    double *low;                            /* [nlow x 9]                                      */
    int     ne, capacity, mask;             /* mask: slots of the table - 1                    */
    int    *pair;                           /* [ne x 2] rows, the first the larger             */
    int    *table;                          /* [mask + 1] of extras, -1: none                  */
};

CLOTH_API cloth_status cloth_matrix_create(const cloth_hooks *hooks, const cloth_pattern *pattern,
                                           cloth_matrix **out) {
    cloth_matrix *A;
    if (out) *out = NULL;
    if (!out || !pattern)
        return clothi_null(hooks, out ? "cloth_matrix_create: pattern"
                                      : "cloth_matrix_create: out");
    A = (cloth_matrix *)clothi_object(hooks, sizeof *A);
    if (A)
        A->diag = (double *)clothi_alloc(hooks, (size_t)pattern->n + (size_t)pattern->nlow + 1,
                                         9 * sizeof(double));
    if (!A || !A->diag) {
        cloth_matrix_destroy(A);
        return CLOTH_ERR_MEMORY;
    }
    A->p = pattern;
    A->low = A->diag + 9 * (size_t)pattern->n;
    *out = A;
    return CLOTH_OK;
}

CLOTH_API void cloth_matrix_destroy(cloth_matrix *A) {
    (void)clothi_object_blocks(A, 2, 1);
}

CLOTH_API size_t cloth_matrix_bytes(const cloth_matrix *A) {
    return clothi_object_blocks(A, 2, 0);
}

CLOTHI_RARE_END

/* to += B, turned: += B'. */
static void clothi_block_add(double *to, const double *B, int turned) {
    int i, j;
    if (turned)
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) to[3 * j + i] += B[3 * i + j];
    else
        for (i = 0; i < 9; i++) to[i] += B[i];
}

static void clothi_clear_range(int begin, int end, int worker, void *ctx) {
    cloth_matrix        *A = (cloth_matrix *)ctx;
    const cloth_pattern *p = A->p;
    const int            i = p->dom[begin], k = p->start[p->strip[begin]];
    (void)worker;
    memset(A->diag + 9 * (size_t)i, 0, 9 * (size_t)(p->dom[end] - i) * sizeof(double));
    memset(A->low + 9 * (size_t)k, 0,
           9 * (size_t)(p->start[p->strip[end]] - k) * sizeof(double));
}

CLOTH_API void cloth_matrix_clear(cloth_matrix *A) {
    if (!A) return;
    clothi_for(&A->hooks, A->p->nd + 1, A->p->nd > 1 ? 1 : 2, clothi_clear_range, A);
    if (A->ne) memset(A->table, 255, ((size_t)A->mask + 1) * sizeof(int));
    A->ne = 0;
}

/* From diag on: all values but the extras. */
static size_t  clothi_matrix_doubles(const cloth_matrix *A) {
    return 9 * ((size_t)A->p->n + (size_t)A->p->nlow);
}
static double *clothi_matrix_diag(cloth_matrix *A, int v) {
    return A->diag + 9 * (size_t)A->p->row_of[v];
}
static double *clothi_matrix_block(cloth_matrix *A, int slot) {
    return A->low + 9 * (size_t)(slot >> 1);
}

/* Blocks of strip q taken from the diagonals of its row and of their columns. */
static void clothi_close_strip(cloth_matrix *A, int q, int own, int other) {
    double *d = A->diag + 9 * (size_t)A->p->row[q];
    int     k, c;
    for (k = A->p->start[q]; k < A->p->start[q + 1]; k++) {
        const double *b = A->low + 9 * (size_t)k;
        double       *e = A->diag + 9 * (size_t)A->p->col[k];
        for (c = 0; own && c < 9; c++) d[c] -= b[c];
        for (c = 0; other && c < 3; c++)
            e[3 * c] -= b[c], e[3 * c + 1] -= b[3 + c], e[3 * c + 2] -= b[6 + c];
    }
}

typedef struct clothi_closing {
    cloth_matrix *A;
    const double *m;
    double        f;
} clothi_closing;

/* Of subdomain d, and after all of them of S. */
CLOTHI_OUTLINE static void clothi_close_range(int begin, int end, int worker, void *ctx) {
    const clothi_closing *c = (const clothi_closing *)ctx;
    cloth_matrix         *A = c->A;
    const cloth_pattern  *p = A->p;
    int                   d, q, k;
    (void)worker;
    for (d = begin; d < end; d++)
        for (q = p->strip[d]; q < p->strip[d + 1]; q++) {
            const int i = p->row[q], own = i < p->dom[d + 1];
            for (k = 0; own && k < 9; k += 4)
                A->diag[9 * (size_t)i + (size_t)k] += c->f * c->m[p->vertex_of[i]];
            for (k = 0; d == p->nd && k < d; k++)
                clothi_close_strip(A, clothi_shared(p, k, i), 1, 0);
            clothi_close_strip(A, q, own, 1);
        }
}

/* D_i += f m_i - sum of the blocks of row i: inertia (m [n] of the vertices) and what elements
 * that do not feel translations leave to the diagonal. Extras bring their own diagonals. */
static void clothi_matrix_close(cloth_matrix *A, const double *m, double f) {
    const int      nd = A->p->nd;
    clothi_closing c;
    c.A = A, c.m = m, c.f = f;
    clothi_for(&A->hooks, nd, 1, clothi_close_range, &c);
    clothi_close_range(nd, nd + 1, 0, &c);
}

/* Where the table has the pair of rows a > b, or would have it: after what is in its way. */
static int *clothi_matrix_extra(const cloth_matrix *A, int a, int b) {
    unsigned at = ((unsigned)a * 2654435761u ^ (unsigned)b * 2246822519u) >> 4;
    for (;; at++) {
        int *slot = A->table + (at & (unsigned)A->mask);
        if (*slot < 0 || (A->pair[2 * *slot] == a && A->pair[2 * *slot + 1] == b)) return slot;
    }
}

CLOTHI_RARE_BEGIN

/* Room for `more` extras; the table is at most half full. */
static cloth_status clothi_matrix_reserve(cloth_matrix *A, size_t more) {
    const cloth_matrix old = *A;
    const size_t       need = (size_t)A->ne + more;
    size_t             room = 1;
    int                e;
    if (need > 100000000) return CLOTH_ERR_CAPACITY;
    if (need <= (size_t)A->capacity) return CLOTH_OK;
    while (room <= 2 * need) room *= 2;     /* 9 doubles each, and 2 + 2 ints                  */
    A->extra = (double *)clothi_alloc(&A->hooks, room, 11 * sizeof(double));
    if (!A->extra) {
        A->extra = old.extra;
        return CLOTH_ERR_MEMORY;
    }
    A->pair = (int *)(A->extra + 9 * room), A->table = A->pair + 2 * room;
    A->capacity = (int)room - 1, A->mask = 2 * (int)room - 1;
    memset(A->table, 255, 2 * room * sizeof(int));
    if (A->ne) memcpy(A->pair, old.pair, (size_t)A->ne * 2 * sizeof(int));
    if (A->ne) memcpy(A->extra, old.extra, (size_t)A->ne * 9 * sizeof(double));
    for (e = 0; e < A->ne; e++) *clothi_matrix_extra(A, A->pair[2 * e], A->pair[2 * e + 1]) = e;
    clothi_free(&A->hooks, old.extra);
    return CLOTH_OK;
}

CLOTHI_RARE_END

static void clothi_matrix_add_extra(cloth_matrix *A, int i, int j, const double *B) {
    const int a = A->p->row_of[i], b = A->p->row_of[j], high = a < b ? b : a, low = a + b - high;
    int      *slot = clothi_matrix_extra(A, high, low);
    if (*slot < 0) {
        *slot = A->ne++;
        A->pair[2 * *slot] = high, A->pair[2 * *slot + 1] = low;
        memset(A->extra + 9 * (size_t)*slot, 0, 9 * sizeof(double));
    }
    clothi_block_add(A->extra + 9 * (size_t)*slot, B, a < b);
}

CLOTH_API cloth_status cloth_matrix_add_element(cloth_matrix *A, int n, const int *v,
                                                const double *H) {
    cloth_status status;
    int          a, b, i, k;
    double       B[9];
    if (!A) return CLOTH_ERR_ARGUMENT;
    if (n < 0 || (n > 0 && (!v || !H)))
        return clothi_fail(&A->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_matrix_add_element: n = %i, or v or H is NULL", n);
    status = clothi_check_indices(&A->hooks, CLOTH_ERR_ARGUMENT, "cloth_matrix_add_element: ", "v",
                                  v, n, 1, A->p->n);
    if (!status && n > 1) status = clothi_matrix_reserve(A, (size_t)n * ((size_t)n - 1) / 2);
    if (status) return status;
    for (a = 0; a < n; a++)
        for (b = 0; b <= a; b++) {
            for (i = 0; i < 3; i++)
                memcpy(B + 3 * i, H + (size_t)(3 * a + i) * (size_t)(3 * n) + 3 * (size_t)b,
                       3 * sizeof(double));
            if (v[a] == v[b]) {             /* a corner named twice meets itself: B + B'       */
                clothi_block_add(clothi_matrix_diag(A, v[a]), B, 0);
                if (a != b) clothi_block_add(clothi_matrix_diag(A, v[a]), B, 1);
                continue;
            }
            k = clothi_pattern_slot(A->p, v[a], v[b]);
            if (k < 0) clothi_matrix_add_extra(A, v[a], v[b], B);
            else clothi_block_add(A->low + 9 * (size_t)(k >> 1), B, k & 1);
        }
    return CLOTH_OK;
}

/* y_i += B x_j, y_j += B' x_i */
static void clothi_block_mul(const double *B, const double *xi, const double *xj, double *yi,
                             double *yj) {
    int a;
    for (a = 0; a < 3; a++) {
        yi[a] += B[3 * a] * xj[0] + B[3 * a + 1] * xj[1] + B[3 * a + 2] * xj[2];
        yj[a] += B[a] * xi[0] + B[3 + a] * xi[1] + B[6 + a] * xi[2];
    }
}

CLOTH_API void cloth_matrix_mul(const cloth_matrix *A, const unsigned char *fixed, const double *x,
                                double *y) {
    const cloth_pattern *p = A->p;
    int i, k, a;
    for (i = 0; i < p->n; i++) {
        const double *D = A->diag + 9 * (size_t)p->row_of[i], *u = x + 3 * (size_t)i;
        for (a = 0; a < 3; a++)
            y[3 * (size_t)i + (size_t)a] =
                D[3 * a] * u[0] + D[3 * a + 1] * u[1] + D[3 * a + 2] * u[2];
    }
    for (i = 0; i < p->strip[p->nd + 1]; i++) {
        const size_t u = 3 * (size_t)p->vertex_of[p->row[i]];
        for (k = p->start[i]; k < p->start[i + 1]; k++) {
            const size_t v = 3 * (size_t)p->vertex_of[p->col[k]];
            clothi_block_mul(A->low + 9 * (size_t)k, x + u, x + v, y + u, y + v);
        }
    }
    for (k = 0; k < A->ne; k++) {
        size_t u = 3 * (size_t)p->vertex_of[A->pair[2 * k]];
        size_t v = 3 * (size_t)p->vertex_of[A->pair[2 * k + 1]];
        clothi_block_mul(A->extra + 9 * (size_t)k, x + u, x + v, y + u, y + v);
    }
    for (i = 0; fixed && i < p->n; i++)
        for (a = 0; a < 3; a++)
            if (fixed[i] >> a & 1) y[3 * (size_t)i + (size_t)a] = 0;
}

/* --- dense panels --- */

#define CLOTHI_PANEL_K   64                 /* columns that one pass of the kernel takes       */
#define CLOTHI_PANEL_PAD 16                 /* rows of the widest tile                         */

/* PS(op) is of four floats, PD(op) of two doubles: intrinsics; without SSE2 or with CLOTH_NO_SIMD
 * plain loops. */
#if defined(CLOTHI_SSE2)
typedef __m128  clothi_f4;
typedef __m128d clothi_d2;
#  define CLOTHI_PS(op) _mm_##op##_ps
#  define CLOTHI_PD(op) _mm_##op##_pd
#else
#  define CLOTHI_PS(op) clothi_##op##_ps
#  define CLOTHI_PD(op) clothi_##op##_pd
#  define CLOTHI_LOOP(V, n, name, op)                                                            \
    CLOTHI_LANE V name(V a, V b) {                                                               \
        int k;                                                                                   \
        for (k = 0; k < n; k++) a.q[k] = a.q[k] op b.q[k];                                       \
        return a;                                                                                \
    }
#  define CLOTHI_LOOPS(T, V, n, p)                                                               \
    typedef struct V { T q[n]; } V;                                                              \
    CLOTHI_LOOP(V, n, clothi_add_##p, +)                                                         \
    CLOTHI_LOOP(V, n, clothi_sub_##p, -)                                                         \
    CLOTHI_LOOP(V, n, clothi_mul_##p, *)                                                         \
    CLOTHI_LANE void clothi_storeu_##p(T *a, V r) { memcpy(a, r.q, sizeof r.q); }                \
    CLOTHI_LANE V clothi_load_##p(const T *a) {                                                  \
        V r;                                                                                     \
        memcpy(r.q, a, sizeof r.q);                                                              \
        return r;                                                                                \
    }                                                                                            \
    CLOTHI_LANE V clothi_set1_##p(T u) {                                                         \
        V   r;                                                                                   \
        int k;                                                                                   \
        for (k = 0; k < n; k++) r.q[k] = u;                                                      \
        return r;                                                                                \
    }
CLOTHI_LOOPS(float, clothi_f4, 4, ps)
CLOTHI_LOOPS(double, clothi_d2, 2, pd)
#endif

/* DV(op) is of the doubles of the widest register; the kernel is written once. */
#if defined(CLOTHI_AVX) && defined(__AVX512F__)
#  define CLOTHI_DV(op) _mm512_##op##_pd
typedef __m512d   clothi_dv;
#elif defined(CLOTHI_AVX)
#  define CLOTHI_DV(op) _mm256_##op##_pd
typedef __m256d   clothi_dv;
#else
#  define CLOTHI_DV(op) CLOTHI_PD(op)
typedef clothi_d2 clothi_dv;
#endif

/* a + b c; V: PS, PD or DV */
#if defined(CLOTHI_AVX) && defined(__FMA__)
#  define CLOTHI_MADD(V, a, b, c) V(fmadd)(b, c, a)
#else
#  define CLOTHI_MADD(V, a, b, c) V(add)(a, V(mul)(b, c))
#endif

enum {
    CLOTHI_WIDTH = sizeof(clothi_dv) / sizeof(double),
    CLOTHI_TILE = 2 * CLOTHI_WIDTH          /* rows of a tile of C; its columns are 4          */
};

/* out [4][CLOTHI_TILE] = sum over p < k of a[p] b[p]': eight registers hold the tile. a begins a
 * cache line. */
static void clothi_panel_tile(const double *a, const double *b, int k, double *out) {
    clothi_dv zero = CLOTHI_DV(set1)(0.0), u, v, w;
    clothi_dv c0 = zero, c1 = zero, c2 = zero, c3 = zero, d0 = zero, d1 = zero, d2 = zero,
              d3 = zero;
    int p;
    for (p = 0; p < k; p++, a += CLOTHI_TILE, b += 4) {
        u = CLOTHI_DV(load)(a);
        v = CLOTHI_DV(load)(a + CLOTHI_WIDTH);
        w = CLOTHI_DV(set1)(b[0]);
        c0 = CLOTHI_MADD(CLOTHI_DV, c0, u, w);
        d0 = CLOTHI_MADD(CLOTHI_DV, d0, v, w);
        w = CLOTHI_DV(set1)(b[1]);
        c1 = CLOTHI_MADD(CLOTHI_DV, c1, u, w);
        d1 = CLOTHI_MADD(CLOTHI_DV, d1, v, w);
        w = CLOTHI_DV(set1)(b[2]);
        c2 = CLOTHI_MADD(CLOTHI_DV, c2, u, w);
        d2 = CLOTHI_MADD(CLOTHI_DV, d2, v, w);
        w = CLOTHI_DV(set1)(b[3]);
        c3 = CLOTHI_MADD(CLOTHI_DV, c3, u, w);
        d3 = CLOTHI_MADD(CLOTHI_DV, d3, v, w);
    }
    CLOTHI_DV(storeu)(out, c0);
    CLOTHI_DV(storeu)(out + CLOTHI_WIDTH, d0);
    CLOTHI_DV(storeu)(out + 2 * CLOTHI_WIDTH, c1);
    CLOTHI_DV(storeu)(out + 3 * CLOTHI_WIDTH, d1);
    CLOTHI_DV(storeu)(out + 4 * CLOTHI_WIDTH, c2);
    CLOTHI_DV(storeu)(out + 5 * CLOTHI_WIDTH, d2);
    CLOTHI_DV(storeu)(out + 6 * CLOTHI_WIDTH, c3);
    CLOTHI_DV(storeu)(out + 7 * CLOTHI_WIDTH, d3);
}

/* C (lower part, rows x cols, column-major) -= A S A' from packed rows. */
typedef struct clothi_panel_job {
    double       *c;
    size_t        ldc;
    int           rows, cols, k;
    const double *a, *b;
} clothi_panel_job;

static void clothi_panel_tiles(int begin, int end, int worker, void *ctx) {
    const clothi_panel_job *g = (const clothi_panel_job *)ctx;
    double acc[4 * CLOTHI_TILE];
    int    tile, i, j, r, c;
    (void)worker;
    for (tile = begin; tile < end; tile++) {
        int row = tile * CLOTHI_TILE;
        int nr = g->rows - row < CLOTHI_TILE ? g->rows - row : CLOTHI_TILE;
        for (j = 0; j < g->cols && j < row + nr; j += 4) {
            int     nc = g->cols - j < 4 ? g->cols - j : 4;
            double *to = g->c + (size_t)j * g->ldc + row;
            clothi_panel_tile(g->a + (size_t)row * (size_t)g->k, g->b + (size_t)j * (size_t)g->k,
                              g->k, acc);
            if (nr == CLOTHI_TILE && nc == 4) {
                for (c = 0; c < 4; c++, to += g->ldc)
                    for (i = 0; i < CLOTHI_TILE; i++) to[i] -= acc[c * CLOTHI_TILE + i];
            } else {
                for (c = 0; c < nc; c++, to += g->ldc)
                    for (r = 0; r < nr; r++) to[r] -= acc[c * CLOTHI_TILE + r];
            }
        }
    }
}

/* Rows [row0, row1) and columns [k0, k1) of a panel, `width` rows side by side, rest zero;
 * sign NULL or one factor per column. */
static void clothi_panel_pack(const double *panel, size_t ld, int row0, int row1, int k0, int k1,
                              int width, const double *sign, double *out) {
    int i, p, r;
    for (i = row0; i < row1; i += width) {
        int n = row1 - i < width ? row1 - i : width;
        for (p = k0; p < k1; p++, out += width) {
            const double *from = panel + (size_t)p * ld + i;
            const double  s = sign ? sign[p] : 1.0;
            for (r = 0; r < n; r++) out[r] = s * from[r];
            for (; r < width; r++) out[r] = 0;
        }
    }
}

/* A S A' of panel columns [k0, k1), rows [row0, m), taken off C. hooks NULL: serial. */
static void clothi_panel_update(const cloth_hooks *hooks, const double *panel, size_t ld, int m,
                                int row0, int cols, int k0, int k1, const double *sign, double *c,
                                size_t ldc, double *pack) {
    clothi_panel_job g;
    double          *b;
    int tiles = (m - row0 + CLOTHI_TILE - 1) / CLOTHI_TILE;
    g.c = c, g.ldc = ldc, g.rows = m - row0, g.cols = cols, g.k = k1 - k0, g.a = pack;
    g.b = b = pack + (size_t)(g.rows + CLOTHI_PANEL_PAD) * (size_t)g.k;
    clothi_panel_pack(panel, ld, row0, m, k0, k1, CLOTHI_TILE, NULL, pack);
    clothi_panel_pack(panel, ld, row0, row0 + cols, k0, k1, 4, sign, b);
    clothi_for(hooks, tiles, 4, clothi_panel_tiles, &g);
}

/* Columns [k0, k1) of a panel of m rows, their earlier updates done: signed Cholesky, one by one.
 * limit [n]: a pivot below it counts as zero and its column as fixed. */
static void clothi_panel_columns(double *panel, size_t ld, int m, int k0, int k1, double *sign,
                                 signed char *pivot, const double *limit) {
    int k, p, i;
    for (k = k0; k < k1; k++) {
        double *c = panel + (size_t)k * ld, d, inv;
        for (p = k0; p < k; p += 3) {           /* three at a time: c is read once for them    */
            const int     p1 = p + 1 < k ? p + 1 : p, p2 = p + 2 < k ? p + 2 : p;
            const double *b0 = panel + (size_t)p * ld, *b1 = panel + (size_t)p1 * ld;
            const double *b2 = panel + (size_t)p2 * ld, s0 = sign[p] * b0[k];
            const double  s1 = p1 > p ? sign[p1] * b1[k] : 0, s2 = p2 > p ? sign[p2] * b2[k] : 0;
            for (i = k; i < m; i++) c[i] -= s0 * b0[i] + s1 * b1[i] + s2 * b2[i];
        }
        d = c[k];
        sign[k] = d < 0 ? -1.0 : 1.0;
        pivot[k] = (signed char)(d > limit[k] ? 1 : d < -limit[k] ? -1 : 0);
        if (!pivot[k]) {
            for (i = k; i < m; i++) c[i] = 0;
            c[k] = clothi_finite(d) ? 1.0 : d;          /* NaN stays, for judge to find        */
            sign[k] = 1;
            continue;
        }
        c[k] = sqrt(fabs(d));
        inv = sign[k] / c[k];
        for (i = k + 1; i < m; i++) c[i] *= inv;
    }
}

/* ===== [7.3] CONJUGATE GRADIENTS ===============================================================
 *
 *   A x = b, A symmetric. CG [HS52] minimises q(x) = x.A x/2 - b.x over growing spaces; with a
 *   preconditioner P ~ A:
 *
 *        x = 0   r = b   z = P^-1 r   d = z
 *        repeat until r.z <= tolerance^2 b.P^-1 b:
 *            alpha = r.z / d.A d      x += alpha d      r -= alpha A d
 *            z = P^-1 r               beta = (r.z)new / (r.z)      d = z + beta d
 *
 *   Every step lowers q by alpha r.z / 2: their sum is report->decrease. clothi_plain_cg() is these
 *   lines, in doubles, for any P: P = D, the diagonal blocks, is CLOTH_LINEAR_JACOBI, to read and
 *   to compare with; with the factor of [7.4] it is CLOTH_LINEAR_CHOLESKY.
 *
 *   Trust region [S83]. With options.radius, the first iterate that leaves max|x| <= radius is
 *   replaced by the point where its segment crosses it, and a direction with d.A d <= 0 is
 *   followed to there: a step that still lowers q.
 *
 *   Four additions make the iterations of CLOTH_LINEAR_SGS few and cheap.
 *
 *   1 Scaling. D_i = G_i G_i' (3x3 Cholesky factors of the diagonal blocks), A' = G^-1 A G^-T,
 *   x = G^-T x', b' = G^-1 b. A' has unit diagonal blocks: no product with D is left, numbers are
 *   near 1 whatever the units, which suits floats. A D_i that is not positive is the first and
 *   cheapest test for negative curvature.
 *
 *   2 Symmetric Gauss-Seidel: with A' = I + L + L', K = I + L, take P = K K'. One sweep forward,
 *   one back; information crosses the subdomain in the order of the rows. A quarter of the
 *   iterations of block Jacobi.
 *
 *   3 Eisenstat's trick [E81]. In the variables p = K' t the system is K^-1 A' K^-T, and
 *           A' = K + K' - I     so     K^-1 A' t = t + K^-1 (K' t - t) = t + K^-1 (p - t):
 *   one back sweep (s = K^-T r) and one forward sweep do the work of product and preconditioner,
 *   2 passes over the triangle instead of 4.
 *
 *                z_i -= B z_j   gather:  rows of B times z_j     <-- K^-1, rows upward
 *                z_j -= B' z_i  scatter: rows of B times z_i[r]  <-- K^-T, rows downward
 *   One copy of B, three rows of four numbers, serves both.
 *
 *   4 Deflation [N87]. Gauss-Seidel hardly moves long waves. Aggregates [7.1] give them a coarse
 *   space, the three translations of each: P one identity block per vertex (0 on fixed axes),
 *   P^ = G' P, V = K' P^ and Ac = P'A P, a band of 3 nc <= 1536 rows, Ac = U'U. CG starts at the
 *   coarse solution and keeps every direction conjugate to the coarse space: t <- t - P^ m with
 *   m = Ac^-1 P^'A' s. That needs V alone: K' P^ m = V m keeps p = K' t, and as K' s = r,
 *           P^'A' s = P^'(K + K' - I) s = V's + P^'(r - s).
 *
 *     r = K^-1 b'    c0 = |r|^2 + P'b.m    m = Ac^-1 P'b    rr = P'b.m    Q = 0
 *     p = V m        t = P^ m                          the coarse solution is the first direction,
 *     w = K^-1 (p - t)     alpha = 1                   its length is known
 *     repeat:
 *       x += alpha t    r -= alpha (t + w)    Q += alpha rr/2
 *       beta = r.r/rr   (0 the first time)    rr = r.r; stop at rr <= tolerance^2 c0
 *       s = K^-T r      m = Ac^-1 (V's + P^'(r - s))
 *       p = r + beta p - V m     t = s + beta t - P^ m
 *       w = K^-1 (p - t)         alpha = rr / p.(t + w)
 *     answer G^-T x
 *
 *   c0 is b in the norm of the preconditioner K K' plus coarse part, so that report->residual =
 *   sqrt(rr/c0) starts from x = 0 whatever the coarse solution is. A quarter of the iterations
 *   are left, and because long waves are then right, Newton needs fewer solves too. What was
 *   tried, and iterations with and without each addition: tests/bench/bench_linear.c.
 *
 *   Blocks C outside the pattern [7.2] are outside K: w = K^-1 (p - t + C t), P^'A's gains P^'C s,
 *   Ac gains P'CP. The sweeps stay as they are.
 *
 *   Floats, and when not. Rounding of D competes with the mass once stiffness over inertia,
 *   q = max_i tr D_i / mean row sum of traces, times 6e-8 is near 1. (Membranes and hinges do not
 *   feel translations: the rows' sums are the inertia.) Up to CLOTHI_FLOAT_STIFFNESS floats solve
 *   as well as doubles. Beyond, and where the residual gets stuck, the same code runs in doubles,
 *   in the same memory, for about 1.5 times the time. A decision is made afresh for every matrix,
 *   so that a restored snapshot goes the same way.
 *
 *   Rounding. At 1e-14 of |b| or so what rounding leaves in V's span, where r is 0 by its
 *   recurrence alone, takes over: |r| then grows tenfold or more in an iteration. CG ends there
 *   without that iteration.
 *
 *   Workers. Subdomains run side by side, the separators S alone; two parallel regions an iteration
 *   (blocks outside the pattern: three):
 *       S: advance, back        | subdomains: advance x r, back sweep, their V's + P^'(r - s)
 *       m = Ac^-1 of the sums   | subdomains: p t, forward sweep, p.w, what S gathers from them
 *       S: forward
 *   The factor of Ac runs beside the first forward sweep. Every sum is made subdomain by subdomain
 *   and added in order: the same bits for any count of workers.
 *
 *   checked: tests/test_sparse.c (all of it against dense algebra), tests/test_sparse_plain.c (the
 *   plain loops), tests/bench/bench_linear.c (times)
 */

#define CLOTHI_LINEAR_TOLERANCE    0.05
#define CLOTHI_LEAST_TOLERANCE     1e-30    /* squares of less than that of |b| may underflow  */
#define CLOTHI_FLOAT_TOLERANCE     1e-4     /* tighter ones are solved in doubles              */
#define CLOTHI_FLOAT_STIFFNESS     8e6      /* stiffness over inertia, see the banner          */
#define CLOTHI_FLOAT_SQUARES       1e-30    /* J, least |b|^2 whose parts do not underflow     */
#define CLOTHI_STAGNATION          60       /* iterations without halving |r|^2                */
#define CLOTHI_FLOOR               1e-10    /* of |b|, below which curvature that is negative  */
#define CLOTHI_REGROWN             10       /* and |r| grown to times its least are rounding's */
#define CLOTHI_CG_CAP              20000

/* Sweeps work on a copy of it: stores of vectors may alias what a pointer leads to, so that fields
 * of the solver and its pattern would be read again after each. */
typedef struct clothi_store {               /* of floats or of doubles, in one block           */
    void *L, *G, *P, *V;                    /* A' below the diagonal by rows; G^-1, G'P, V by
                                               columns                                         */
    void *r, *p, *t, *w, *x;                /* [n] records; s and w share one: a row of s is
                                               read before the row of w is written             */
    void *sep;                              /* [nd x ns] what subdomains give rows of S        */
    void *zpart, *m;                        /* [(nd+1) x nc] sums of P^'A's; [nc]              */
    const int *row, *start, *col, *agg, *vp, *vj;           /* the pattern's                   */
    int   nc, ns;                           /* aggregates, rows of S                           */
} clothi_store;

typedef struct clothi_tally {               /* one subdomain's share of the sums               */
    double rr, pq, trace, top, big;
    int    bad;                             /* some diagonal block is not positive             */
    int    narrow;                          /* one is, but not in floats                       */
} clothi_tally;

struct cloth_linear_solver {
    cloth_hooks hooks;
    void   *block;                          /* the store's arrays, or r z d q of the plain CG, or
                                               between solves what a sim puts there: one at a time
                                               needs it                                        */
    void   *E;                              /* blocks outside the pattern, scaled, by rows     */
    double *pack;                           /* rows of a panel; the block of U and Ac too      */
    double *cd;                             /* [(nd+3) x 3nc]: two to work in, then P'b of each
                                               subdomain and of S; the block of envelope too   */
    const cloth_pattern *p;
    size_t  least;                          /* bytes that the sim asks for                     */
    clothi_store st;
    int     extras;                         /* room in E                                       */
    void   *U;                              /* factor of Ac: blocks by rows, diagonals inverse */
    double *Ac;                             /* band of 3 nc rows                               */
    int     band;                           /* aggregates that a row of Ac and U has room for  */
    int    *envelope;                       /* [nc + 1] where rows of Ac end with all blocks,
                                               increasing; then places for gather and scatter  */
    struct cloth_factor *factor;            /* [7.4], made when first asked for                */
    int     only;                           /* 0; 1, 2: floats, doubles only (tests)           */
    /* the solve in hand */
    const cloth_matrix  *A;
    const unsigned char *fixed;
    double *to;                             /* [n x 3] b, 0 on fixed axes; then the answer     */
    int     wide, first, part, radius_on, bad_pivot;
    double  alpha, beta;
    clothi_tally tally[CLOTHI_DOMAINS + 1];
};

/* --- the textbook, in doubles --- */

typedef struct clothi_cg {                  /* the numbers of a run                            */
    double tolerance, radius;
    double c0, rr, pq, Q;
    int    it, most;
    int    negative, hit;
    double best;                            /* smallest rr, and since when                     */
    int    best_at;
} clothi_cg;

/* Bits of the fixed axes of a row. */
CLOTHI_LANE int clothi_mask(const cloth_linear_solver *s, int row) {
    return s->fixed ? s->fixed[s->p->vertex_of[row]] & 7 : 0;
}

/* B without the rows of mi and the columns of mj: B itself when there are none, else in out. */
CLOTHI_LANE const double *clothi_masked(const double *B, int mi, int mj, double *out) {
    int k;
    if (!(mi | mj)) return B;
    for (k = 0; k < 9; k++) out[k] = (mi >> (k / 3) & 1) || (mj >> (k % 3) & 1) ? 0 : B[k];
    return out;
}

/* The diagonal block of a row, 1 on fixed axes, into d [9]; returns their bits. */
CLOTHI_LANE int clothi_diagonal(const cloth_linear_solver *s, int row, double *d) {
    const int m = clothi_mask(s, row);
    int       k;
    memcpy(d, s->A->diag + 9 * (size_t)row, 9 * sizeof *d);
    for (k = 0; m && k < 9; k++)
        if ((m >> k / 3 | m >> k % 3) & 1) d[k] = k % 4 == 0;
    return m;
}

/* The least tau >= 0 at which |x + tau d| reaches the radius (largest component); `tau` before:
 * of other numbers, -1: there were none. */
static double clothi_reach(double tau, const double *x, const double *d, size_t n, double radius) {
    size_t i;
    for (i = 0; i < n; i++)
        if (fabs(d[i]) > 0) {
            const double u = (radius - (d[i] > 0 ? x[i] : -x[i])) / fabs(d[i]);
            if (tau < 0 || u < tau) tau = u > 0 ? u : 0;
        }
    return tau;
}

CLOTHI_RARE_BEGIN

/* z = P^-1 r, fixed axes 0; 1 when P is not positive. */
typedef int clothi_precondition_fn(cloth_linear_solver *s, const double *r, double *z);

/* P = D. With a radius a block that is not positive is replaced by one at least as large. */
static int clothi_jacobi(cloth_linear_solver *s, const double *r, double *z) {
    int i, k, m;
    for (i = 0; i < s->p->n; i++) {
        const int     v = s->p->vertex_of[i];
        const double *q = r + 3 * (size_t)v;
        double        d[9], c[3], det, *out = z + 3 * (size_t)v;
        m = clothi_diagonal(s, i, d);
        clothi_cross3(d + 3, d + 6, c);
        det = clothi_dot3(d, c);
        if (!(d[0] > 0) || !(d[0] * d[4] - d[1] * d[3] > 0) || !(det > 0)) {
            if (!s->radius_on) return 1;
            for (k = 0; k < 3; k++) {
                const double sum = fabs(d[3 * k]) + fabs(d[3 * k + 1]) + fabs(d[3 * k + 2]);
                out[k] = m >> k & 1 ? 0 : q[k] / (sum > 0 ? sum : 1);
            }
            continue;
        }
        for (k = 0; k < 3; k++) {           /* D^-1 q: a row of D^-1 is a cross product / det  */
            clothi_cross3(d + 3 * ((k + 1) % 3), d + 3 * ((k + 2) % 3), c);
            out[k] = m >> k & 1 ? 0 : clothi_dot3(q, c) / det;
        }
    }
    return 0;
}

/* x, from 0, by the pseudo-code of the banner. */
static cloth_status clothi_plain_cg(cloth_linear_solver *s, clothi_precondition_fn *precondition,
                                    clothi_cg *g) {
    const size_t n = 3 * (size_t)s->p->n;
    double      *r = (double *)s->block, *z = r + n, *d = z + n, *q = d + n, big, alpha, rr;
    double      *x = s->to;
    size_t       i;
    s->wide = 1;
    memcpy(r, x, n * sizeof(double));
    memset(x, 0, n * sizeof(double));
    if (precondition(s, r, z)) return CLOTH_ERR_NUMERIC;
    memcpy(d, z, n * sizeof(double));
    g->rr = g->c0 = clothi_dot(r, z, n);
    if (!clothi_finite(g->c0)) return CLOTH_ERR_NONFINITE;
    if (g->c0 < 0) return CLOTH_ERR_NUMERIC;
    while (g->rr > g->tolerance * g->tolerance * g->c0 && g->it < g->most) {
        cloth_matrix_mul(s->A, s->fixed, d, q);
        g->pq = clothi_dot(d, q, n);
        if (!clothi_finite(g->pq)) return CLOTH_ERR_NONFINITE;
        g->negative = !(g->pq > 0);
        alpha = g->negative ? 0 : g->rr / g->pq;
        for (i = 0, big = 0; i < n; i++) big = clothi_max(fabs(x[i] + alpha * d[i]), big);
        if (g->radius > 0 && (g->negative || !(big <= g->radius))) {
            const double tau = clothi_max(clothi_reach(-1, x, d, n, g->radius), 0);
            for (i = 0; i < n; i++) x[i] += tau * d[i];
            g->Q += tau * g->rr - 0.5 * tau * tau * g->pq;
            g->hit = 1;
            g->it++;
            break;
        }
        if (g->negative) {
            if (g->it > 0) break;
            memcpy(x, d, n * sizeof(double));
            g->Q = g->rr - 0.5 * g->pq;
            break;
        }
        for (i = 0; i < n; i++) x[i] += alpha * d[i], r[i] -= alpha * q[i];
        (void)precondition(s, r, z);
        rr = clothi_dot(r, z, n);
        for (i = 0; i < n; i++) d[i] = z[i] + rr / g->rr * d[i];
        g->Q += 0.5 * alpha * g->rr;
        g->rr = rr;
        g->it++;
    }
    return clothi_finite(g->rr) ? CLOTH_OK : CLOTH_ERR_NONFINITE;
}

CLOTHI_RARE_END

/* --- four numbers at a time, floats or doubles --- */

/* A vertex has a record of four numbers (three and a zero), a block three records. The code of
 * this section is written once: `w` is a constant in every call, 0 for float and 1 for double, and
 * the compiler drops the other half. */
typedef struct clothi_v4 {
    clothi_f4 f;
    clothi_d2 d, e;
} clothi_v4;

/* u in all four; what the width does not use is dropped. */
CLOTHI_LANE clothi_v4 clothi_all4(double u) {
    clothi_v4 r;
    r.f = CLOTHI_PS(set1)((float)u);
    r.d = r.e = CLOTHI_PD(set1)(u);
    return r;
}

CLOTHI_LANE clothi_v4 clothi_zero4(void) { return clothi_all4(0); }

/* Record i of an array of floats or doubles. */
CLOTHI_LANE clothi_v4 clothi_load4(const void *a, size_t i, const int w) {
    clothi_v4 r = clothi_zero4();
    if (w) {
        r.d = CLOTHI_PD(load)((const double *)a + 4 * i);
        r.e = CLOTHI_PD(load)((const double *)a + 4 * i + 2);
    } else r.f = CLOTHI_PS(load)((const float *)a + 4 * i);
    return r;
}

CLOTHI_LANE void clothi_store4(void *a, size_t i, clothi_v4 r, const int w) {
    if (w) {
        CLOTHI_PD(storeu)((double *)a + 4 * i, r.d);
        CLOTHI_PD(storeu)((double *)a + 4 * i + 2, r.e);
    } else CLOTHI_PS(storeu)((float *)a + 4 * i, r.f);
}

/* (B[0], B[1], B[2], 0) from doubles. */
CLOTHI_LANE clothi_v4 clothi_cut4(const double *B, const int w) {
    clothi_v4 r = clothi_zero4();
#if defined(CLOTHI_SSE2)
    r.d = _mm_loadu_pd(B);
    r.e = _mm_load_sd(B + 2);
    if (!w) r.f = _mm_movelh_ps(_mm_cvtpd_ps(r.d), _mm_cvtpd_ps(r.e));
#else
    int k;
    r.d.q[0] = B[0], r.d.q[1] = B[1], r.e.q[0] = B[2];
    for (k = 0; !w && k < 3; k++) r.f.q[k] = (float)B[k];
#endif
    return r;
}

#define CLOTHI_OP4(name, op)                                                                     \
    CLOTHI_LANE clothi_v4 name(clothi_v4 a, clothi_v4 b, const int w) {                          \
        if (w) {                                                                                 \
            a.d = CLOTHI_PD(op)(a.d, b.d);                                                       \
            a.e = CLOTHI_PD(op)(a.e, b.e);                                                       \
        } else a.f = CLOTHI_PS(op)(a.f, b.f);                                                    \
        return a;                                                                                \
    }
CLOTHI_OP4(clothi_add4, add)
CLOTHI_OP4(clothi_sub4, sub)
CLOTHI_OP4(clothi_mul4, mul)

/* a + b c */
CLOTHI_LANE clothi_v4 clothi_madd4(clothi_v4 a, clothi_v4 b, clothi_v4 c, const int w) {
    if (w) {
        a.d = CLOTHI_MADD(CLOTHI_PD, a.d, b.d, c.d);
        a.e = CLOTHI_MADD(CLOTHI_PD, a.e, b.e, c.e);
    } else a.f = CLOTHI_MADD(CLOTHI_PS, a.f, b.f, c.f);
    return a;
}

CLOTHI_LANE double clothi_get(const void *a, size_t i, const int w) {
    return w ? ((const double *)a)[i] : (double)((const float *)a)[i];
}

/* Number j of record i in all four. */
CLOTHI_LANE clothi_v4 clothi_lane4(const void *a, size_t i, size_t j, const int w) {
    return clothi_all4(clothi_get(a, 4 * i + j, w));
}

/* (sum of a, sum of b, sum of c, 0): the rows of a block times a record. */
CLOTHI_LANE clothi_v4 clothi_rows4(clothi_v4 a, clothi_v4 b, clothi_v4 c, const int w) {
#if defined(CLOTHI_SSE2)
    if (w) {
        a.d = _mm_add_pd(a.d, a.e);
        b.d = _mm_add_pd(b.d, b.e);
        c.d = _mm_add_pd(c.d, c.e);
        a.d = _mm_add_pd(_mm_unpacklo_pd(a.d, b.d), _mm_unpackhi_pd(a.d, b.d));
        a.e = _mm_add_pd(_mm_unpacklo_pd(c.d, _mm_setzero_pd()),
                         _mm_unpackhi_pd(c.d, _mm_setzero_pd()));
    } else {
        __m128 z = _mm_setzero_ps();
        _MM_TRANSPOSE4_PS(a.f, b.f, c.f, z);
        a.f = _mm_add_ps(_mm_add_ps(a.f, b.f), _mm_add_ps(c.f, z));
    }
    return a;
#else
    const clothi_v4 v[3] = {a, b, c};
    double          sum[4] = {0, 0, 0, 0};
    clothi_v4       r = clothi_zero4();
    int             k;
    for (k = 0; k < 3; k++)
        if (w) sum[k] = (v[k].d.q[0] + v[k].d.q[1]) + (v[k].e.q[0] + v[k].e.q[1]);
        else r.f.q[k] = (v[k].f.q[0] + v[k].f.q[1]) + (v[k].f.q[2] + v[k].f.q[3]);
    return w ? clothi_load4(sum, 0, 1) : r;
#endif
}

/* Products of a and b added to four sums, always doubles. */
CLOTHI_LANE clothi_v4 clothi_dot4(clothi_v4 sum, clothi_v4 a, clothi_v4 b, const int w) {
    if (w) return clothi_madd4(sum, a, b, 1);
    a.f = CLOTHI_PS(mul)(a.f, b.f);
#if defined(CLOTHI_SSE2)
    sum.d = _mm_add_pd(sum.d, _mm_cvtps_pd(a.f));
    sum.e = _mm_add_pd(sum.e, _mm_cvtps_pd(_mm_movehl_ps(a.f, a.f)));
#else
    sum.d.q[0] += (double)a.f.q[0], sum.d.q[1] += (double)a.f.q[1];
    sum.e.q[0] += (double)a.f.q[2], sum.e.q[1] += (double)a.f.q[3];
#endif
    return sum;
}

/* Doubles of such sums. */
CLOTHI_LANE void clothi_spill4(clothi_v4 sum, double *q) {
    memcpy(q, &sum.d, sizeof sum.d);
    memcpy(q + 2, &sum.e, sizeof sum.e);
}

CLOTHI_LANE double clothi_sum4(clothi_v4 sum) {
    double q[4];
    clothi_spill4(sum, q);
    return (q[0] + q[1]) + (q[2] + q[3]);
}

CLOTHI_LANE void clothi_put(void *a, size_t i, double u, const int w) {
    if (w) ((double *)a)[i] = u;
    else ((float *)a)[i] = (float)u;
}

/* B [9] into block i of a, the fourth numbers 0. */
CLOTHI_LANE void clothi_put9(void *a, size_t i, const double *B, const int w) {
    size_t k;
    for (k = 0; k < 3; k++) clothi_store4(a, 3 * i + k, clothi_cut4(B + 3 * k, w), w);
}

/* M u of record i, M in the records 3k, 3k+1, 3k+2 by columns; its transpose times u when M is
 * there by rows. */
CLOTHI_LANE clothi_v4 clothi_columns4(const void *M, size_t k, const void *u, size_t i,
                                      const int w) {
    clothi_v4 r = clothi_mul4(clothi_load4(M, 3 * k, w), clothi_lane4(u, i, 0, w), w);
    r = clothi_madd4(r, clothi_load4(M, 3 * k + 1, w), clothi_lane4(u, i, 1, w), w);
    return clothi_madd4(r, clothi_load4(M, 3 * k + 2, w), clothi_lane4(u, i, 2, w), w);
}

/* M' u, M the block k by columns. */
CLOTHI_LANE clothi_v4 clothi_transposed4(const void *M, size_t k, clothi_v4 u, const int w) {
    return clothi_rows4(clothi_mul4(clothi_load4(M, 3 * k, w), u, w),
                        clothi_mul4(clothi_load4(M, 3 * k + 1, w), u, w),
                        clothi_mul4(clothi_load4(M, 3 * k + 2, w), u, w), w);
}

/* Sum of blocks L[k], by rows, times records z[col[k]], k0 <= k < k1. */
CLOTHI_LANE clothi_v4 clothi_gather4(const void *L, const int *col, int k0, int k1, const void *z,
                                     const int w) {
    clothi_v4 a = clothi_zero4(), b = a, c = a;
    int       k;
    for (k = k0; k < k1; k++) {
        const clothi_v4 u = clothi_load4(z, (size_t)col[k], w);
        a = clothi_madd4(a, clothi_load4(L, 3 * (size_t)k, w), u, w);
        b = clothi_madd4(b, clothi_load4(L, 3 * (size_t)k + 1, w), u, w);
        c = clothi_madd4(c, clothi_load4(L, 3 * (size_t)k + 2, w), u, w);
    }
    return clothi_rows4(a, b, c, w);
}

/* z[col[k]] -= L[k]' u, u record i of z, k0 <= k < k1. */
CLOTHI_LANE void clothi_scatter4(const void *L, const int *col, int k0, int k1, void *z, size_t i,
                                 const int w) {
    const clothi_v4 o = clothi_zero4(), u0 = clothi_sub4(o, clothi_lane4(z, i, 0, w), w);
    const clothi_v4 u1 = clothi_sub4(o, clothi_lane4(z, i, 1, w), w);
    const clothi_v4 u2 = clothi_sub4(o, clothi_lane4(z, i, 2, w), w);
    int k;
    for (k = k0; k < k1; k++) {
        const size_t j = (size_t)col[k], b = 3 * (size_t)k;
        clothi_v4 v = clothi_madd4(clothi_load4(z, j, w), clothi_load4(L, b, w), u0, w);
        clothi_v4 q = clothi_mul4(clothi_load4(L, b + 1, w), u1, w);
        q = clothi_madd4(q, clothi_load4(L, b + 2, w), u2, w);
        clothi_store4(z, j, clothi_add4(v, q, w), w);
    }
}

/* Calls f with its last argument a constant: 1 for doubles, 0 for floats. */
#define CLOTHI_BY_WIDTH(wide, f, ...) ((wide) ? f(__VA_ARGS__, 1) : f(__VA_ARGS__, 0))

/* The range of a parallel loop over subdomains, d = nd standing for S: f(s, d, w) of each. */
#define CLOTHI_BY_DOMAIN(name, f)                                                                \
    CLOTHI_OUTLINE static void name(int begin, int end, int worker, void *ctx) {                 \
        cloth_linear_solver *s = (cloth_linear_solver *)ctx;                                     \
        int                  d;                                                                  \
        (void)worker;                                                                            \
        for (d = begin; d < end; d++) CLOTHI_BY_WIDTH(s->wide, f, s, d);                         \
    }

/* --- memory --- */

#define CLOTHI_COARSE_BLOCK 24              /* columns of the coarse factor at a time          */

CLOTHI_RARE_BEGIN

/* Lays the store's arrays into one block; with base NULL only counts its bytes. */
static size_t clothi_store_lay(const cloth_pattern *p, size_t real, clothi_store *st, char *base) {
    const size_t n = (size_t)p->n, nc = (size_t)p->nc, nd = (size_t)p->nd;
    const size_t ns = n - (size_t)p->dom[p->nd];
    const size_t records[12] = {3 * (size_t)p->nlow, 3 * n, 3 * n, 3 * (size_t)p->vp[p->n],
                                n, n, n, n, n, nd * ns, (nd + 1) * nc, nc};
    void **const field[12] = {&st->L, &st->G, &st->P, &st->V, &st->r, &st->p,
                              &st->t, &st->w, &st->x, &st->sep, &st->zpart, &st->m};
    size_t at = 0, k;
    for (k = 0; k < 12; k++) {
        if (base) *field[k] = base + at;
        at += (4 * real * records[k] + CLOTHI_ALIGN - 1) / CLOTHI_ALIGN * CLOTHI_ALIGN;
    }
    st->row = p->row, st->start = p->start, st->col = p->col, st->agg = p->agg;
    st->vp = p->vp, st->vj = p->vj, st->nc = p->nc, st->ns = (int)ns;
    return at;
}

/* How far the rows of Ac reach: what the pattern couples, what blocks outside of it do, and what
 * elimination fills up. Returns the longest row, in aggregates. */
static int clothi_coarse_envelope(const cloth_linear_solver *s, const cloth_matrix *A, int *to) {
    const cloth_pattern *p = s->p;
    int e, a, longest = 0;
    memcpy(to, p->envelope, (size_t)p->nc * sizeof(int));
    for (e = 0; e < A->ne; e++) {
        const int u = p->agg[A->pair[2 * e]], v = p->agg[A->pair[2 * e + 1]];
        const int low = u < v ? u : v, high = u < v ? v : u;
        if (low >= 0 && to[low] < high + 1) to[low] = high + 1;
    }
    for (a = 0; a < p->nc; a++) {
        if (a > 0 && to[a] < to[a - 1]) to[a] = to[a - 1];
        if (to[a] - a > longest) longest = to[a] - a;
    }
    return longest;
}

/* Numbers from a row of Ac to the next: a panel takes its columns to the end of the longest, and
 * its tiles spoil what is just above the diagonal. */
static size_t clothi_coarse_ld(int band) {
    return 3 * (size_t)band + CLOTHI_COARSE_BLOCK + CLOTHI_PANEL_PAD;
}

/* The columns of Ac that its row k may fill while the panel with it is factored. */
static int clothi_coarse_end(const cloth_linear_solver *s, int k) {
    const int last = (k / CLOTHI_COARSE_BLOCK + 1) * CLOTHI_COARSE_BLOCK / 3 - 1;
    return 3 * s->envelope[last < s->p->nc ? last : s->p->nc - 1];
}

/* Room for solves with A: in doubles, so that no later one that needs them must allocate. */
static cloth_status clothi_solver_reserve(cloth_linear_solver *s, const cloth_matrix *A) {
    const int    band = clothi_coarse_envelope(s, A, s->envelope);
    const size_t n3 = 3 * (size_t)s->p->nc;
    if (!s->block) {
        const size_t store = clothi_store_lay(s->p, sizeof(double), &s->st, NULL);
        const size_t plain = 12 * (size_t)s->p->n * sizeof(double);
        const size_t most = store > plain ? store : plain;
        s->block = clothi_alloc(&s->hooks, most > s->least ? most : s->least, 1);
        if (!s->block) return CLOTH_ERR_MEMORY;
    }
    if (s->extras < A->ne) {
        void *more = clothi_alloc(&s->hooks, (size_t)A->capacity, 12 * sizeof(double));
        if (!more) return CLOTH_ERR_MEMORY;
        clothi_free(&s->hooks, s->E);
        s->E = more;
        s->extras = A->capacity;
    }
    if (s->band < band) {
        const int    room = s->band == 0 ? band : 2 * band < s->p->nc ? 2 * band : s->p->nc;
        const size_t ld = clothi_coarse_ld(room), packed = 2 * (ld + CLOTHI_PANEL_PAD) *
                                                           CLOTHI_COARSE_BLOCK;
        const size_t factor = 4 * n3 * (size_t)room;
        double      *pack = (double *)clothi_alloc(
            &s->hooks, packed + factor + (n3 + 1) * (ld + 1), sizeof(double));
        if (!pack) return CLOTH_ERR_MEMORY;
        clothi_free(&s->hooks, s->pack);
        s->pack = pack, s->U = pack + packed, s->Ac = pack + packed + factor, s->band = room;
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_linear_solver_create(const cloth_hooks *hooks,
                                                  const cloth_pattern *pattern,
                                                  cloth_linear_solver **out) {
    cloth_linear_solver *s;
    size_t               nc, n, a;
    if (out) *out = NULL;
    if (!out || !pattern)
        return clothi_null(hooks, out ? "cloth_linear_solver_create: pattern"
                                      : "cloth_linear_solver_create: out");
    nc = (size_t)pattern->nc;
    n = 3 * nc * (size_t)(pattern->nd + 3);
    s = (cloth_linear_solver *)clothi_object(hooks, sizeof *s);
    if (s) s->cd = (double *)clothi_alloc(hooks, n + nc + 1, sizeof(double));
    if (!s || !s->cd) {
        cloth_linear_solver_destroy(s);
        return CLOTH_ERR_MEMORY;
    }
    s->p = pattern;
    s->envelope = (int *)(s->cd + n);
    for (a = 0; a < nc; a++) s->envelope[nc + 1 + a] = (int)a;
    *out = s;
    return CLOTH_OK;
}

CLOTH_API void cloth_linear_solver_destroy(cloth_linear_solver *s) {
    if (s) cloth_factor_destroy(s->factor);
    (void)clothi_object_blocks(s, 4, 1);
}

CLOTH_API size_t cloth_linear_solver_bytes(const cloth_linear_solver *s) {
    return s ? cloth_factor_bytes(s->factor) + clothi_object_blocks(s, 4, 0) : 0;
}

CLOTH_API cloth_linear_options cloth_linear_options_default(void) {
    cloth_linear_options o;
    memset(&o, 0, sizeof o);
    o.tolerance = CLOTHI_LINEAR_TOLERANCE;
    return o;
}

CLOTHI_RARE_END

/* --- set-up: scaling and V --- */

/* What of a subdomain, or of S, is of its rows alone. D = G G': G^-1 and P^ = G' P by columns; D in
 * V. Fixed axes: D is 1 and P is 0. */
CLOTHI_OUTLINE static void clothi_factor_rows(cloth_linear_solver *s, int part) {
    const cloth_pattern *p = s->p;
    const clothi_store  *st = &s->st;
    clothi_tally        *y = s->tally + part;
    const size_t block = 12 * (s->wide ? sizeof(double) : sizeof(float));
    const int    begin = p->dom[part], end = p->dom[part + 1];
    int          i;
    memset((char *)st->V + block * (size_t)p->vp[begin], 0,
           block * (size_t)(p->vp[end] - p->vp[begin]));
    for (i = begin; i < end; i++) {
        const double *D = s->A->diag + 9 * (size_t)i;
        double        d[9], G[9], L[9], P[9], q, r;
        const int     m = clothi_diagonal(s, i, d);
        if (p->agg[i] >= 0)
            clothi_put9(st->V, (size_t)p->vp[i], clothi_masked(D, m, m, P), s->wide);
        q = d[4] - d[3] * (d[3] / d[0]);
        if (!(d[0] > 0) || !(q > 1e-13 * d[4])) break;
        L[1] = L[2] = L[5] = G[3] = G[6] = G[7] = 0;
        L[0] = sqrt(d[0]);
        L[3] = d[3] / L[0];
        L[6] = d[6] / L[0];
        L[4] = sqrt(q);
        L[7] = (d[7] - L[6] * L[3]) / L[4];
        r = d[8] - L[6] * L[6] - L[7] * L[7];
        if (!(r > 1e-13 * d[8])) break;
        if (!(q > 1e-7 * d[4]) || !(r > 1e-7 * d[8])) y->narrow = 1;
        L[8] = sqrt(r);
        G[0] = 1 / L[0];
        G[1] = -L[3] / (L[0] * L[4]);
        G[2] = -(L[6] / L[0] + L[7] * G[1]) / L[8];
        G[4] = 1 / L[4];
        G[5] = -L[7] / (L[4] * L[8]);
        G[8] = 1 / L[8];
        clothi_put9(st->G, (size_t)i, G, s->wide);
        clothi_put9(st->P, (size_t)i, clothi_masked(L, m, 0, P), s->wide);
        r = D[0] + D[4] + D[8];
        y->trace += r;
        if (r > y->top) y->top = r;
    }
    if (i < end) y->bad = 1;
}

/* Block k of out, by rows: G_i^-1 B G_j^-T, of the block B by rows. */
CLOTHI_LANE void clothi_scale_block(const clothi_store *st, int i, int j, const void *B, void *out,
                                    size_t k, const int w) {
    const size_t    g = 3 * (size_t)i;
    const clothi_v4 b0 = clothi_columns4(st->G, (size_t)j, B, 0, w);
    const clothi_v4 b1 = clothi_columns4(st->G, (size_t)j, B, 1, w);
    const clothi_v4 b2 = clothi_columns4(st->G, (size_t)j, B, 2, w);
    clothi_v4       r = clothi_mul4(clothi_lane4(st->G, g, 0, w), b0, w);
    clothi_store4(out, 3 * k, r, w);
    r = clothi_mul4(clothi_lane4(st->G, g, 1, w), b0, w);
    r = clothi_madd4(r, clothi_lane4(st->G, g + 1, 1, w), b1, w);
    clothi_store4(out, 3 * k + 1, r, w);
    r = clothi_mul4(clothi_lane4(st->G, g, 2, w), b0, w);
    r = clothi_madd4(r, clothi_lane4(st->G, g + 1, 2, w), b1, w);
    r = clothi_madd4(r, clothi_lane4(st->G, g + 2, 2, w), b2, w);
    clothi_store4(out, 3 * k + 2, r, w);
}

CLOTHI_LANE void clothi_add_record(void *a, size_t i, clothi_v4 v, const int w) {
    clothi_store4(a, i, clothi_add4(clothi_load4(a, i, w), v, w), w);
}

/* Subdomain d, after S: its rows, then its blocks, scaled and added to V of their columns. */
CLOTHI_LANE void clothi_setup_any(cloth_linear_solver *s, int d, const int w) {
    const clothi_store st = s->st;
    clothi_tally      *y = s->tally + d;
    const int          end = s->p->strip[d + 1];
    double             cut[9];
    clothi_v4          B[2];                /* room for three records                          */
    int                q, k;
    clothi_factor_rows(s, d);
    for (q = s->p->strip[d]; q < end && !y->bad; q++) {
        const int i = st.row[q], own = st.agg[i], mi = clothi_mask(s, i), last = st.start[q + 1];
        double    trace = 0;
        for (k = st.start[q]; k < last; k++) {
            const int     j = st.col[k];
            const double *raw = s->A->low + 9 * (size_t)k;
            clothi_put9(B, 0, clothi_masked(raw, mi, clothi_mask(s, j), cut), w);
            if (own >= 0) {                 /* columns of B' are the rows of B                 */
                size_t at = (size_t)st.vp[j];
                while (st.vj[at] != own) at++;
                clothi_add_record(st.V, 3 * at, clothi_load4(B, 0, w), w);
                clothi_add_record(st.V, 3 * at + 1, clothi_load4(B, 1, w), w);
                clothi_add_record(st.V, 3 * at + 2, clothi_load4(B, 2, w), w);
            }
            trace += raw[0] + raw[4] + raw[8];
            clothi_scale_block(&st, i, j, B, st.L, (size_t)k, w);
        }
        y->trace += 2 * trace;
    }
}

CLOTHI_BY_DOMAIN(clothi_setup_range, clothi_setup_any)

/* --- the coarse matrix --- */

/* B, a block of rows of aggregate u and columns of v, and its transposed, into the upper band. */
static void clothi_coarse_add(double *Ac, size_t ld, int u, int v, const double *B) {
    double *to = Ac + 3 * (size_t)(u < v ? u : v) * ld + 3 * (size_t)(u < v ? v : u), *at;
    int     a;
    for (a = 0, at = to; a < 3 && u <= v; a++, at += ld)
        at[0] += B[3 * a], at[1] += B[3 * a + 1], at[2] += B[3 * a + 2];
    for (a = 0, at = to; a < 3 && v <= u; a++, at += ld)
        at[0] += B[a], at[1] += B[3 + a], at[2] += B[6 + a];
}

/* Ac = P'A P = W + W' - P'D P, W = P'V before V is scaled. Blocks outside the pattern: scaled into
 * E, added here. Row k of Ac begins at Ac + k ld, its column k at Ac + k (ld + 1). */
CLOTHI_OUTLINE static void clothi_coarse_matrix(cloth_linear_solver *s, size_t ld) {
    const cloth_pattern *p = s->p;
    double    B[9], cut[9];
    clothi_v4 raw[2];                       /* room for three records                          */
    int       i, k, m, a;
    for (k = 0; k < 3 * p->nc; k++)
        memset(s->Ac + (size_t)k * (ld + 1), 0,
               (size_t)(clothi_coarse_end(s, k) - k) * sizeof(double));
    for (i = 0; i < p->n; i++)
        for (m = p->vp[i]; m < p->vp[i + 1] && p->agg[i] >= 0; m++) {
            for (a = 0; a < 3; a++)
                for (k = 0; k < 3; k++)
                    B[3 * a + k] = clothi_get(s->st.V, 12 * (size_t)m + (size_t)(4 * k + a),
                                              s->wide);
            if (m == p->vp[i]) {
                const int     f = clothi_mask(s, i);
                const double *D = clothi_masked(s->A->diag + 9 * (size_t)i, f, f, cut);
                for (k = 0; k < 9; k++) B[k] -= 0.5 * D[k];
            }
            clothi_coarse_add(s->Ac, ld, p->agg[i], p->vj[m], B);
        }
    for (k = 0; k < s->A->ne; k++) {
        const int     r = s->A->pair[2 * k], c = s->A->pair[2 * k + 1];
        const double *C = clothi_masked(s->A->extra + 9 * (size_t)k, clothi_mask(s, r),
                                        clothi_mask(s, c), cut);
        clothi_put9(raw, 0, C, s->wide);
        CLOTHI_BY_WIDTH(s->wide, clothi_scale_block, &s->st, r, c, raw, s->E, (size_t)k);
        if (p->agg[r] >= 0 && p->agg[c] >= 0)
            clothi_coarse_add(s->Ac, ld, p->agg[r], p->agg[c], C);
    }
}

/* Block (a, b) of U from row 3a of the factor; of the diagonal its inverse, zero at zero pivots. */
CLOTHI_LANE void clothi_coarse_block(cloth_linear_solver *s, const double *row, size_t ld, int a,
                                     int b, const signed char *pivot, const int w) {
    double B[9], T[9];
    int    k;
    for (k = 0; k < 9; k++) B[k] = row[(size_t)(k / 3) * ld + 3 * (size_t)b + (size_t)(k % 3)];
    if (a == b) {
        memset(T, 0, sizeof T);
        for (k = 0; k < 3; k++) T[4 * k] = pivot[3 * a + k] / B[4 * k];
        T[1] = -T[0] * B[1] * T[4];
        T[5] = -T[4] * B[5] * T[8];
        T[2] = -(T[0] * B[2] + T[1] * B[5]) * T[8];
        memcpy(B, T, sizeof B);
    }
    clothi_put9(s->U, (size_t)a * (size_t)s->band + (size_t)(b - a), B, w);
}

/* Ac = U'U in place, upper by rows, which is U' lower by columns. A translation that nothing holds
 * (all its axes fixed, or a piece without mass) gives a zero pivot and is left out. False where a
 * pivot is negative beyond rounding. */
CLOTHI_OUTLINE static int clothi_coarse_factor(cloth_linear_solver *s) {
    const int    n = 3 * s->p->nc;
    const size_t ld = clothi_coarse_ld(s->band);
    double      *A = s->Ac, *sign = s->cd + n;
    signed char  pivot[3 * CLOTHI_AGG_MAX];
    int          k, k1, m, a, b;
    clothi_coarse_matrix(s, ld);
    for (k = 0; k < n; k++)
        s->cd[k] = (s->wide ? 1e-12 : 1e-6) * fabs(A[(size_t)k * (ld + 1)]);
    for (k = 0; k < n; k = k1) {
        k1 = k + CLOTHI_COARSE_BLOCK < n ? k + CLOTHI_COARSE_BLOCK : n;
        m = clothi_coarse_end(s, k);
        clothi_panel_columns(A, ld, m, k, k1, sign, pivot, s->cd);
        if (k1 < m)
            clothi_panel_update(NULL, A, ld, m, k1, m - k1, k, k1, sign,
                                A + (size_t)k1 * (ld + 1), ld, s->pack);
    }
    for (k = 0; k < n; k++)
        if (pivot[k] < 0 || !clothi_finite(A[(size_t)k * (ld + 1)])) return 0;
    for (a = 0; a < s->p->nc; a++)
        for (b = a; b < s->envelope[a]; b++)
            CLOTHI_BY_WIDTH(s->wide, clothi_coarse_block, s, A + 3 * (size_t)a * ld, ld, a, b,
                            pivot);
    return 1;
}

/* Block k of an array of records. */
CLOTHI_LANE const void *clothi_at4(const void *a, size_t k, const int w) {
    return (const char *)a + 12 * k * (w ? sizeof(double) : sizeof(float));
}

/* Records m = Ac^-1 b; b [3nc], or NULL: P^'A's, the sums of the subdomains and of S. U' down the
 * rows by scattering, U up them by gathering. */
CLOTHI_LANE void clothi_coarse_any(cloth_linear_solver *s, const double *b, const int w) {
    const size_t nc = (size_t)s->p->nc;
    const int   *number = s->envelope + nc + 1;
    const void  *U;
    void        *m = s->st.m;
    size_t       at;
    int          i, d, length;
    for (at = 0; at < nc; at++) {
        clothi_v4 sum = clothi_zero4();
        double    q[4];
        for (d = 0; d <= s->p->nd && !b; d++)
            sum = clothi_dot4(sum, clothi_load4(s->st.zpart, (size_t)d * nc + at, w),
                              clothi_all4(1), w);
        clothi_spill4(sum, q);
        clothi_store4(m, at, clothi_cut4(b ? b + 3 * at : q, w), w);
    }
    for (i = 0; i < s->p->nc; i++) {
        at = (size_t)i;
        U = clothi_at4(s->U, at * (size_t)s->band, w), length = s->envelope[i] - i;
        clothi_store4(m, at, clothi_columns4(U, 0, m, at, w), w);
        clothi_scatter4(U, number + i, 1, length, m, at, w);
    }
    for (i = s->p->nc - 1; i >= 0; i--) {
        at = (size_t)i;
        U = clothi_at4(s->U, at * (size_t)s->band, w), length = s->envelope[i] - i;
        clothi_store4(m, at, clothi_sub4(clothi_load4(m, at, w),
                                         clothi_gather4(U, number + i, 1, length, m, w), w), w);
        clothi_store4(m, at, clothi_gather4(U, number + i, 0, 1, m, w), w);
    }
}

CLOTHI_OUTLINE static void clothi_coarse_apply(cloth_linear_solver *s, const double *b) {
    CLOTHI_BY_WIDTH(s->wide, clothi_coarse_any, s, b);
}

/* --- sweeps --- */

/* Sum of the blocks of strip q times the records of their columns. */
CLOTHI_LANE clothi_v4 clothi_gather_strip(const clothi_store *st, int q, const void *z,
                                          const int w) {
    return clothi_gather4(st->L, st->col, st->start[q], st->start[q + 1], z, w);
}

/* What subdomain d gives the rows of S in a forward sweep of z. */
CLOTHI_LANE void clothi_give_rest(cloth_linear_solver *s, int d, const void *z, const int w) {
    const clothi_store st = s->st;
    const int          first = s->p->n - st.ns;
    int                i;
    for (i = 0; d < s->p->nd && i < st.ns; i++)
        clothi_store4(st.sep, (size_t)d * (size_t)st.ns + (size_t)i,
                      clothi_gather_strip(&st, clothi_shared(s->p, d, first + i), z, w), w);
}

/* zi minus what K takes of z in strip q: in a subdomain by the blocks of its row; in S by those
 * within S, and what `given` subdomains gave its row i. */
CLOTHI_LANE clothi_v4 clothi_forward_row(const clothi_store *st, int given, int i, int q,
                                         clothi_v4 zi, const void *z, const int w) {
    int k;
    for (k = 0; k < given; k++)
        zi = clothi_sub4(zi, clothi_load4(st->sep, (size_t)(k * st->ns + i), w), w);
    return clothi_sub4(zi, clothi_gather_strip(st, q, z, w), w);
}

/* z <- K^-T z of subdomain d, after S; of S before the subdomains. */
CLOTHI_LANE void clothi_back_sweep(cloth_linear_solver *s, int d, void *z, const int w) {
    const clothi_store st = s->st;
    const int          end = s->p->strip[d];
    int                q;
    for (q = s->p->strip[d + 1] - 1; q >= end; q--)
        clothi_scatter4(st.L, st.col, st.start[q], st.start[q + 1], z, (size_t)st.row[q], w);
}

/* G^-T of record i of z, metres again: q [4]. */
CLOTHI_LANE void clothi_metres(const clothi_store *st, const void *z, int i, double *q,
                               const int w) {
    const clothi_v4 v = clothi_transposed4(st->G, (size_t)i, clothi_load4(z, (size_t)i, w), w);
    clothi_spill4(clothi_dot4(clothi_zero4(), v, clothi_all4(1), w), q);
}

/* --- one iteration --- */

/* r <- K^-1 b' of subdomain d, with its shares of |r|^2 and of P'b; of S after the subdomains. */
CLOTHI_LANE void clothi_enter_rows(cloth_linear_solver *s, int d, const int w) {
    const cloth_pattern *p = s->p;
    const clothi_store   st = s->st;
    const int  first = p->dom[d], given = d == p->nd ? d : 0;
    void      *r = st.r;
    double    *cd = s->cd + (size_t)(d + 2) * 3 * (size_t)p->nc;
    clothi_v4  sum = clothi_zero4();
    int        i, k, q = p->strip[d];
    memset(cd, 0, 3 * (size_t)p->nc * sizeof(double));
    for (i = p->dom[d]; i < p->dom[d + 1]; i++) {
        const double *b = s->to + 3 * (size_t)p->vertex_of[i];
        const size_t  at = (size_t)i;
        clothi_v4     v;
        for (k = 0; k < 3 && p->agg[i] >= 0; k++) cd[3 * p->agg[i] + k] += b[k];
        clothi_store4(r, at, clothi_cut4(b, w), w);
        v = clothi_forward_row(&st, given, i - first, q++, clothi_columns4(st.G, at, r, at, w), r,
                               w);
        clothi_store4(r, at, v, w);
        sum = clothi_dot4(sum, v, v, w);
    }
    s->tally[d].rr = clothi_sum4(sum);
    clothi_give_rest(s, d, r, w);
}

/* The coarse factor, which takes longest, beside the subdomains' sweeps: 0, 1 + d. */
CLOTHI_LANE void clothi_enter_any(cloth_linear_solver *s, int d, const int w) {
    if (d == 0) s->bad_pivot = !clothi_coarse_factor(s);
    else clothi_enter_rows(s, d - 1, w);
}

CLOTHI_BY_DOMAIN(clothi_enter_range, clothi_enter_any)

/* V of subdomain d, or of S, scaled; x = 0. */
CLOTHI_LANE void clothi_scale_rows(cloth_linear_solver *s, int d, const int w) {
    const cloth_pattern *p = s->p;
    int i, m;
    for (i = p->dom[d]; i < p->dom[d + 1]; i++) {
        for (m = 3 * p->vp[i]; m < 3 * p->vp[i + 1]; m++)
            clothi_store4(s->st.V, (size_t)m,
                          clothi_columns4(s->st.G, (size_t)i, s->st.V, (size_t)m, w), w);
        clothi_store4(s->st.x, (size_t)i, clothi_zero4(), w);
    }
}

CLOTHI_BY_DOMAIN(clothi_scale_range, clothi_scale_rows)

/* Subdomain d, or S: x += alpha t, r -= alpha (t + w), s = r; |r|^2, and max |G^-T x| when a radius
 * is set. */
CLOTHI_LANE void clothi_advance_rows(cloth_linear_solver *s, int d, const int w) {
    const clothi_store st = s->st;
    const clothi_v4    alpha = clothi_all4(s->alpha), minus = clothi_all4(-s->alpha);
    clothi_v4          sum = clothi_zero4();
    double             big = 0, q[4];
    const int          bounded = s->radius_on, end = s->p->dom[d + 1];
    int                i, k;
    for (i = s->p->dom[d]; i < end; i++) {
        const size_t    at = (size_t)i;
        const clothi_v4 t = clothi_load4(st.t, at, w);
        clothi_v4       r = clothi_load4(st.r, at, w);
        clothi_store4(st.x, at, clothi_madd4(clothi_load4(st.x, at, w), alpha, t, w), w);
        r = clothi_madd4(r, minus, clothi_add4(t, clothi_load4(st.w, at, w), w), w);
        clothi_store4(st.r, at, r, w);
        clothi_store4(st.w, at, r, w);
        sum = clothi_dot4(sum, r, r, w);
        if (!bounded) continue;
        clothi_metres(&st, st.x, i, q, w);
        for (k = 0; k < 3; k++) big = clothi_max(fabs(q[k]), big);
    }
    s->tally[d].rr = clothi_sum4(sum);
    s->tally[d].big = big;
}

/* V's + P^'(r - s) of subdomain d, or of S, into its sums. */
CLOTHI_LANE void clothi_restrict(cloth_linear_solver *s, int d, const int w) {
    const clothi_store st = s->st;
    const size_t first = (size_t)d * (size_t)st.nc;
    const int    end = s->p->dom[d + 1];
    size_t       c;
    int          i, k;
    for (c = 0; c < (size_t)st.nc; c++) clothi_store4(st.zpart, first + c, clothi_zero4(), w);
    for (i = s->p->dom[d]; i < end; i++) {
        const clothi_v4 v = clothi_load4(st.w, (size_t)i, w);
        for (k = st.vp[i]; k < st.vp[i + 1]; k++) {
            const size_t b = 3 * (size_t)k, q = 3 * (size_t)i;
            clothi_v4    a0 = clothi_mul4(clothi_load4(st.V, b, w), v, w);
            clothi_v4    a1 = clothi_mul4(clothi_load4(st.V, b + 1, w), v, w);
            clothi_v4    a2 = clothi_mul4(clothi_load4(st.V, b + 2, w), v, w);
            if (k == st.vp[i] && st.agg[i] >= 0) {
                const clothi_v4 u = clothi_sub4(clothi_load4(st.r, (size_t)i, w), v, w);
                a0 = clothi_madd4(a0, clothi_load4(st.P, q, w), u, w);
                a1 = clothi_madd4(a1, clothi_load4(st.P, q + 1, w), u, w);
                a2 = clothi_madd4(a2, clothi_load4(st.P, q + 2, w), u, w);
            }
            clothi_add_record(st.zpart, first + (size_t)st.vj[k], clothi_rows4(a0, a1, a2, w), w);
        }
    }
}

/* First half of an iteration in subdomain d; in S before the subdomains. */
CLOTHI_LANE void clothi_back_any(cloth_linear_solver *s, int d, const int w) {
    clothi_advance_rows(s, d, w);
    clothi_back_sweep(s, d, s->st.w, w);
    clothi_restrict(s, d, w);
}

CLOTHI_BY_DOMAIN(clothi_back_range, clothi_back_any)

/* Blocks outside the pattern: y += C v, or with y NULL P^' C v into the sums of S. A block acts on
 * its row and, transposed, on its column. */
CLOTHI_LANE void clothi_extras_any(cloth_linear_solver *s, const void *v, void *y, const int w) {
    const clothi_store *st = &s->st;
    const int          *pair = s->A->pair, *agg = s->p->agg;
    const int           first = s->p->nd * s->p->nc;
    int                 e;
    for (e = 0; e < s->A->ne; e++) {
        const size_t    i = (size_t)pair[2 * e], j = (size_t)pair[2 * e + 1];
        const clothi_v4 a = clothi_gather4(s->E, pair + 1 + e, e, e + 1, v, w);
        const clothi_v4 b = clothi_columns4(s->E, (size_t)e, v, i, w);
        if (y) {
            clothi_add_record(y, i, a, w);
            clothi_add_record(y, j, b, w);
            continue;
        }
        if (agg[i] >= 0)
            clothi_add_record(st->zpart, (size_t)(first + agg[i]),
                              clothi_transposed4(st->P, i, a, w), w);
        if (agg[j] >= 0)
            clothi_add_record(st->zpart, (size_t)(first + agg[j]),
                              clothi_transposed4(st->P, j, b, w), w);
    }
}

CLOTHI_OUTLINE static void clothi_extras_apply(cloth_linear_solver *s, const void *v, void *y) {
    CLOTHI_BY_WIDTH(s->wide, clothi_extras_any, s, v, y);
}

/* Row i: p = r + beta p - V m, t = s + beta t - P^ m; returns p - t. The coarse solution m, the
 * first direction, stands alone: p = V m, t = P^ m with -m for m. */
CLOTHI_LANE clothi_v4 clothi_turn_row(const clothi_store *st, int first, int i, clothi_v4 beta,
                                      const int w) {
    const size_t at = (size_t)i;
    clothi_v4    u = clothi_zero4(), v = u;
    int          k;
    if (!first) {
        u = clothi_madd4(clothi_load4(st->r, at, w), beta, clothi_load4(st->p, at, w), w);
        v = clothi_madd4(clothi_load4(st->w, at, w), beta, clothi_load4(st->t, at, w), w);
    }
    for (k = st->vp[i]; k < st->vp[i + 1]; k++)
        u = clothi_sub4(u, clothi_columns4(st->V, (size_t)k, st->m, (size_t)st->vj[k], w), w);
    if (st->agg[i] >= 0)
        v = clothi_sub4(v, clothi_columns4(st->P, at, st->m, (size_t)st->agg[i], w), w);
    clothi_store4(st->p, at, u, w);
    clothi_store4(st->t, at, v, w);
    return clothi_sub4(u, v, w);
}

/* Second half of an iteration in subdomain d: p, t, w = K^-1 (p - t), p.(t + w); in S after the
 * subdomains. With blocks outside the pattern C t, which needs all of t, joins w = p - t: part 1
 * comes before it, part 2 after; 0: the whole. */
CLOTHI_LANE void clothi_turn_any(cloth_linear_solver *s, int d, const int w) {
    const clothi_store st = s->st;
    const clothi_v4    beta = clothi_all4(s->beta);
    clothi_v4          sum = clothi_zero4();
    const int part = s->part, first = s->first, given = d == s->p->nd ? d : 0;
    const int begin = s->p->dom[d], end = s->p->dom[d + 1];
    int       i, q = s->p->strip[d];
    for (i = begin; i < end; i++) {
        const size_t at = (size_t)i;
        clothi_v4    v = part < 2 ? clothi_turn_row(&st, first, i, beta, w)
                                  : clothi_load4(st.w, at, w);
        if (part != 1) v = clothi_forward_row(&st, given, i - begin, q++, v, st.w, w);
        clothi_store4(st.w, at, v, w);
        sum = clothi_dot4(sum, clothi_load4(st.p, at, w),
                          clothi_add4(v, clothi_load4(st.t, at, w), w), w);
    }
    s->tally[d].pq = clothi_sum4(sum);
    if (part != 1) clothi_give_rest(s, d, st.w, w);
}

CLOTHI_BY_DOMAIN(clothi_turn_range, clothi_turn_any)

/* p, t, w and p.(t + w) = p.K^-1 A K^-T p. */
static double clothi_turn(cloth_linear_solver *s) {
    const int nd = s->p->nd;
    double    pq = 0;
    int       d;
    s->part = s->A->ne > 0;
    if (s->part) {
        clothi_for(&s->hooks, nd + 1, nd > 1 ? 1 : 2, clothi_turn_range, s);
        clothi_extras_apply(s, s->st.t, s->st.w);
        s->part = 2;
    }
    clothi_for(&s->hooks, nd, 1, clothi_turn_range, s);
    clothi_turn_range(nd, nd + 1, 0, s);
    for (d = 0; d <= nd; d++) pq += s->tally[d].pq;
    return pq;
}

/* Rows of subdomain d, or of S, of the answer, in metres and in the order of the vertices. */
CLOTHI_LANE void clothi_give_rows(cloth_linear_solver *s, int d, const int w) {
    double q[4];
    int    i;
    for (i = s->p->dom[d]; i < s->p->dom[d + 1]; i++) {
        clothi_metres(&s->st, s->st.x, i, q, w);
        memcpy(s->to + 3 * (size_t)s->p->vertex_of[i], q, 3 * sizeof(double));
    }
}

CLOTHI_BY_DOMAIN(clothi_give_range, clothi_give_rows)

/* --- one solve: CLOTH_ERR_NUMERIC where the matrix is not positive; CLOTH_ERR_NONFINITE, which in
 * floats says that they do not do --- */

CLOTHI_RARE_BEGIN

/* All of the set-up: r = K^-1 b', m = -Ac^-1 P'b, c0, and rr = pq = P'b.m. */
static cloth_status clothi_setup(cloth_linear_solver *s, clothi_cg *g) {
    const cloth_pattern *p = s->p;
    const int n3 = 3 * p->nc, grain = p->nd > 1 ? 1 : 3;
    double    trace = 0, top = 0, *Pb = s->cd + n3;
    int       d, i, bad = 0, narrow = 0;
    memset(s->tally, 0, sizeof s->tally);
    clothi_setup_range(p->nd, p->nd + 1, 0, s);
    clothi_for(&s->hooks, p->nd, 1, clothi_setup_range, s);
    for (d = 0; d <= p->nd; d++) {
        bad |= s->tally[d].bad, narrow |= s->tally[d].narrow;
        trace += s->tally[d].trace;
        top = clothi_max(s->tally[d].top, top);
    }
    for (d = 0; d < s->A->ne; d++)
        for (i = 0; i < 9; i += 4) trace += 2 * s->A->extra[9 * d + i];
    if (bad) return CLOTH_ERR_NUMERIC;
    if (!s->wide && (narrow || !(top * p->n <= CLOTHI_FLOAT_STIFFNESS * trace)))
        return CLOTH_ERR_NONFINITE;
    clothi_for(&s->hooks, p->nd + 1, grain, clothi_enter_range, s);
    if (s->bad_pivot) return s->wide ? CLOTH_ERR_NUMERIC : CLOTH_ERR_NONFINITE;
    clothi_enter_range(p->nd + 1, p->nd + 2, 0, s);
    clothi_for(&s->hooks, p->nd + 1, grain, clothi_scale_range, s);
    memset(Pb, 0, (size_t)n3 * sizeof(double));
    for (d = 0; d <= p->nd; d++) {
        g->c0 += s->tally[d].rr;
        for (i = 0; i < n3; i++) Pb[i] -= s->cd[(d + 2) * n3 + i];
    }
    clothi_coarse_apply(s, Pb);
    for (i = 0; i < n3; i++)
        g->rr += Pb[i] * clothi_get(s->st.m, (size_t)(4 * (i / 3) + i % 3), s->wide);
    g->pq = g->rr;
    g->c0 += g->rr;
    if (!s->wide && !(g->c0 > CLOTHI_FLOAT_SQUARES)) return CLOTH_ERR_NONFINITE;
    return clothi_finite(g->c0) ? CLOTH_OK : CLOTH_ERR_NONFINITE;
}

/* x += f t */
static void clothi_along(cloth_linear_solver *s, double f) {
    size_t k, n = 4 * (size_t)s->p->n;
    for (k = 0; k < n; k++)
        clothi_put(s->st.x, k, clothi_get(s->st.x, k, s->wide) +
                               f * clothi_get(s->st.t, k, s->wide), s->wide);
}

/* Goes along t to the radius and ends there. */
static void clothi_boundary(cloth_linear_solver *s, clothi_cg *g) {
    double tau = -1, x[4], t[4];
    int    i;
    for (i = 0; i < s->p->n; i++) {
        CLOTHI_BY_WIDTH(s->wide, clothi_metres, &s->st, s->st.x, i, x);
        CLOTHI_BY_WIDTH(s->wide, clothi_metres, &s->st, s->st.t, i, t);
        tau = clothi_reach(tau, x, t, 3, g->radius);
    }
    tau = clothi_max(tau, 0);
    clothi_along(s, tau);
    g->Q += tau * g->rr - 0.5 * tau * tau * g->pq;
    g->hit = 1;
    if (s->first) g->rr = g->c0;
    else g->it++;
}

/* |r| has been so small that what comes then is rounding's. */
static int clothi_sunk(const clothi_cg *g) {
    return g->best < CLOTHI_FLOOR * CLOTHI_FLOOR * g->c0;
}

/* After a step: 1 when the run is over. */
static int clothi_judge(cloth_linear_solver *s, clothi_cg *g, cloth_status *status) {
    double rr = 0, big = 0;
    int    d;
    for (d = 0; d <= s->p->nd; d++) {
        rr += s->tally[d].rr;
        big = clothi_max(s->tally[d].big, big);
    }
    if (!s->first && clothi_sunk(g) && rr > CLOTHI_REGROWN * CLOTHI_REGROWN * g->best) {
        clothi_along(s, -s->alpha);
        return 1;
    }
    if (s->radius_on && !(big <= g->radius)) {
        clothi_along(s, -s->alpha);
        clothi_boundary(s, g);
        return 1;
    }
    g->Q += 0.5 * s->alpha * g->rr;
    s->beta = s->first ? 0 : rr / g->rr;
    g->it += !s->first;
    g->rr = rr;
    if (!clothi_finite(rr)) {
        *status = CLOTH_ERR_NONFINITE;
        return 1;
    }
    if (!(rr > g->tolerance * g->tolerance * g->c0) || g->it >= g->most) return 1;
    if (s->first || rr < 0.5 * g->best) {
        g->best = rr;
        g->best_at = g->it;
    } else if (!s->wide && g->it - g->best_at > CLOTHI_STAGNATION) {
        if (s->only != 1) *status = CLOTH_ERR_NONFINITE;
        return 1;
    }
    return 0;
}

/* The banner's second pseudo-code, in one precision. */
static cloth_status clothi_run_cg(cloth_linear_solver *s, clothi_cg *g) {
    cloth_status status;
    (void)clothi_store_lay(s->p, s->wide ? sizeof(double) : sizeof(float), &s->st,
                           (char *)s->block);
    status = clothi_setup(s, g);
    if (status) return status;
    for (s->first = 1;; s->first = 0) {
        const double pq = clothi_turn(s);
        if (!s->first) g->pq = pq;
        if (!s->first && !(pq > 0)) break;
        s->alpha = s->first ? 1 : g->rr / pq;
        clothi_back_range(s->p->nd, s->p->nd + 1, 0, s);
        clothi_for(&s->hooks, s->p->nd, 1, clothi_back_range, s);
        if (clothi_judge(s, g, &status)) return status;
        if (s->A->ne) clothi_extras_apply(s, s->st.w, NULL);
        clothi_coarse_apply(s, NULL);
    }
    if (!clothi_finite(g->pq)) return CLOTH_ERR_NONFINITE;
    if (clothi_sunk(g)) return CLOTH_OK;
    g->negative = 1;
    if (s->radius_on) clothi_boundary(s, g);
    else if (g->it == 0 && !(g->Q > 0)) {   /* nothing yet: the preconditioned gradient        */
        clothi_along(s, 1);
        g->Q += g->rr - 0.5 * g->pq;
    }
    return CLOTH_OK;
}

/* In floats, or where they do not do in doubles. */
static cloth_status clothi_sgs_solve(cloth_linear_solver *s, clothi_cg *g) {
    const clothi_cg clean = *g;
    cloth_status    status;
    s->wide = s->only ? s->only == 2 : g->tolerance < CLOTHI_FLOAT_TOLERANCE;
    for (;; s->wide = 1) {
        *g = clean;
        status = clothi_run_cg(s, g);
        if (s->wide || status != CLOTH_ERR_NONFINITE) break;
    }
    if (status) return status;
    clothi_for(&s->hooks, s->p->nd + 1, s->p->nd > 1 ? 1 : 2, clothi_give_range, s);
    return CLOTH_OK;
}

CLOTHI_RARE_END

/* ===== [7.4] SPARSE CHOLESKY =================================================================
 *
 *        +-----+--+-----+            The dissection of [7.1] goes on, down to parts of about 24
 *        |  0  |S2|  1  |            vertices. Elimination fills in what it couples, and two parts
 *        +-----+--+-----+            are coupled through their separators only: all that the
 *        |      S6      |            elimination of a part changes lies on its boundary, the later
 *        +-----+--+-----+            vertices that it or its children touch. Its front is the
 *        |  3  |S5|  4  |            dense matrix of its own unknowns and those:
 *        +-----+--+-----+
 *                                       own      | L11      |     L11 = chol
 *      elimination 0 1 S2 3 4 S5 S6     boundary | L21    U |     U -= L21 L21'
 *
 *   A front is assembled from the blocks of A whose earlier vertex the part owns, and from the
 *   update matrices U of its children, each added at the places that its boundary has in the
 *   parent's front ("extend-add"). Then its own columns are factored, and its U waits for the
 *   parent: the multifrontal method [DR83] [D06].
 *
 *   A = L S L',  S = diag(+-1). No pivoting: the sign of each pivot is kept, and by Sylvester's
 *   law the negative ones count the negative eigenvalues of A. A pivot below 1e-14 of its diagonal
 *   entry counts as zero and its unknown as fixed. For the first bad pivot k, d = L'^-1 e_k has
 *   d'Ad = s_k: a direction of negative curvature, which statics walks down.
 *
 *   cost      a sheet of n vertices: O(n^1.5) flops, O(n log n) numbers. Nearly all flops are the
 *             rank-k updates of dense panels [7.2]. The subdomains' subtrees run side by side, then
 *             the separators above them with their updates split by rows; no sum depends on the
 *             number of workers.
 *   extras    blocks outside the pattern are not in the factor: it preconditions CG then, and CG
 *             also refines: without them one or two iterations reach the tolerance.
 *
 * checked: tests/test_cholesky.c
 */

/* A block of A on its way into a front: slot as in clothi_pattern_slot, front vertices row, col. */
typedef struct clothi_front_entry {
    int slot2, row, col;
} clothi_front_entry;

typedef struct clothi_front {               /* of a part                                       */
    int    mid, hi;                         /* it eliminates verts[mid, hi)                    */
    int    n, nb;                           /* unknowns: its own, the boundary's               */
    int    bound, entry;                    /* where its lists begin; the next front ends them */
    size_t panel;                           /* where its L begins, doubles                     */
    size_t temp, update;                    /* U on the stack: made, kept for the parent       */
} clothi_front;

struct cloth_factor {
    cloth_hooks hooks;
    /* what the pattern decides */
    clothi_front *front;                    /* [nparts+2]                                      */
    int    *bound;                          /* boundaries by elimination number; and of
                                               relative                                        */
    clothi_front_entry *entry;              /* [nlow] blocks of A by part                      */
    /* numbers */
    double *work;                           /* [(nd+1) x npack] packed rows; and of all below  */
    double *stack;                          /* [nstack] update matrices                        */
    double *panel;                          /* all L, part by part, column-major               */
    double *sign;                           /* [3 nv] +1 -1 by elimination                     */
    double *vec;                            /* [2 x 3 nv] right-hand side, and a boundary      */
    signed char *pivot;                     /* [3 nv] -1 negative, 0 zero, 1 positive          */
    unsigned char *fixed;                   /* [nv] by elimination number                      */
    /* and what is no block of its own */
    int    *relative;                       /* of bound: places in the parents' fronts         */
    const cloth_pattern *p;                 /* borrowed                                        */
    size_t  npack, nstack;                  /* doubles of packed rows a task; of the stack     */
    double  flops;
    const cloth_matrix *A;                  /* during compute                                  */
    double  shift;
    int     ready, first_bad;               /* elimination index 3 e + axis, -1                */
};

CLOTHI_RARE_BEGIN

/* --- the fronts --- */

/* Blocks of A by the part that owns their earlier vertex, and the boundaries of all parts: e, the
 * later vertex of a block, is on that of the earlier one's part and of each part above that e
 * comes after. Blocks are taken by e, so that boundaries increase. row is e for now. */
static cloth_status clothi_front_lists(cloth_factor *f) {
    const cloth_pattern *p = f->p;
    const size_t n = (size_t)p->n, np = (size_t)p->nparts, nlow = (size_t)p->nlow;
    int   *where = (int *)clothi_alloc(&f->hooks, 3 * n + 1 + np + 3 * nlow, sizeof(int));
    int   *owner, *first, *seen, *early, *late, *order, i, k, q, pass;
    size_t sum = 0;
    if (!where) return CLOTH_ERR_MEMORY;
    owner = where + n, first = owner + n, seen = first + n + 1;
    early = seen + np, late = early + nlow, order = late + nlow;
    for (q = 0; q < p->nparts; q++) {
        f->front[q].mid = p->part[q].mid, f->front[q].hi = p->part[q].hi;
        for (i = p->part[q].mid; i < p->part[q].hi; i++) where[p->verts[i]] = i, owner[i] = q;
    }
    for (i = 0; i < p->strip[p->nd + 1]; i++)
        for (k = p->start[i]; k < p->start[i + 1]; k++) {
            const int a = where[p->vertex_of[p->row[i]]], b = where[p->vertex_of[p->col[k]]];
            early[k] = a < b ? a : b, late[k] = a + b - early[k];
        }
    clothi_sort_by(p->nlow, p->n, late, NULL, order, first);
    for (pass = 0; pass < 2; pass++) {      /* count, then place                               */
        memset(seen, 255, np * sizeof(int));
        for (i = 0; i < p->nlow; i++) {
            const int e = late[order[i]], low = early[order[i]];
            for (q = owner[low]; e >= f->front[q].hi && seen[q] != e; q = p->part[q].parent) {
                seen[q] = e;
                if (pass) f->bound[f->front[q + 1].bound] = e;
                f->front[q + 2 - pass].bound++;
            }
            q = owner[low];
            if (pass) {
                clothi_front_entry *to = f->entry + f->front[q + 1].entry;
                to->slot2 = 2 * order[i] + (p->row_of[p->verts[e]] < p->row_of[p->verts[low]]);
                to->row = e, to->col = low - f->front[q].mid;
            }
            f->front[q + 2 - pass].entry++;
        }
        for (q = 1; q <= p->nparts && !pass; q++) {
            sum += (size_t)f->front[q + 1].bound;
            f->front[q + 1].bound = (int)sum, f->front[q + 1].entry += f->front[q].entry;
        }
        if (!pass && sum <= 0x7fffffff)
            f->bound = (int *)clothi_alloc(&f->hooks, sum, 2 * sizeof(int));
        if (!f->bound) break;
    }
    clothi_free(&f->hooks, where);
    if (sum <= 0x7fffffff) return f->bound ? CLOTH_OK : CLOTH_ERR_MEMORY;
    return clothi_fail(&f->hooks, CLOTH_ERR_CAPACITY, "factor: rows of %z vertices", sum);
}

/* Index in the front of part q of the vertex with elimination number e. */
static int clothi_front_index(const cloth_factor *f, int q, int e) {
    const clothi_front *w = f->front + q;
    if (e < w->hi) return e - w->mid;
    return w->hi - w->mid + clothi_lower_bound(f->bound, w->bound, w[1].bound, e) - w->bound;
}

/* Places of all numbers. Update matrices of a subdomain live on one stack: those of the children
 * are on its top when a front is assembled above them, and its own then takes their place. */
static void clothi_front_layout(cloth_factor *f) {
    const cloth_pattern *p = f->p;
    size_t panel = 0, top = 0;
    int    q;
    for (q = 0; q < p->nparts; q++) {
        clothi_front *w = f->front + q;
        const int     c = p->part[q].child[0], domain = p->part[q].domain;
        const size_t  n = 3 * (size_t)(w->hi - w->mid), b = 3 * (size_t)(w[1].bound - w->bound);
        const size_t  pack = 2 * (n + b + CLOTHI_PANEL_PAD) * CLOTHI_PANEL_K;
        w->n = (int)n, w->nb = (int)b, w->panel = panel;
        panel += n * (n + b);
        if (pack > f->npack) f->npack = pack;
        f->flops += (double)n * ((double)n * (double)n / 3 + (double)b * (double)(n + b));
        if (domain < 0 || q == 0 || p->part[q - 1].domain != domain) top = f->nstack;
        w->temp = top;
        w->update = domain < 0 || c < 0 ? top : f->front[c].update;
        top = w->update + b * b;
        if (w->temp + b * b > f->nstack) f->nstack = w->temp + b * b;
    }
    f->front[p->nparts].panel = panel;
}

CLOTHI_RARE_END

/* --- numbers --- */

#define CLOTHI_ZERO_PIVOT 1e-14             /* of the diagonal of A: smaller pivots are zero   */
#define CLOTHI_FRONT_BLOCK 24               /* columns factored one by one                     */

/* Factors the front's panel and takes its product off the update matrix U. */
static void clothi_front_factor(cloth_factor *f, const cloth_hooks *hooks, const clothi_front *w,
                                double *U, double *pack) {
    const int    n = w->n, nb = w->nb;
    const size_t m = (size_t)(n + nb), at = 3 * (size_t)w->mid;
    double *L = f->panel + w->panel, *sign = f->sign + at;
    int k0, k1;
    for (k0 = 0; k0 < n; k0 = k1) {
        k1 = k0 + CLOTHI_FRONT_BLOCK < n ? k0 + CLOTHI_FRONT_BLOCK : n;
        clothi_panel_columns(L, m, n + nb, k0, k1, sign, f->pivot + at, f->vec + at);
        if (k1 < n)
            clothi_panel_update(hooks, L, m, n + nb, k1, n - k1, k0, k1, sign,
                                L + (size_t)k1 * m + k1, m, pack);
    }
    for (k0 = 0; nb && k0 < n; k0 = k1) {
        k1 = k0 + CLOTHI_PANEL_K < n ? k0 + CLOTHI_PANEL_K : n;
        clothi_panel_update(hooks, L, m, n + nb, n, nb, k0, k1, sign, U, (size_t)nb, pack);
    }
}

/* Adds one 3 x 3 block of A to the panel at front vertices (row, col), fixed unknowns left out. */
static void clothi_front_add(double *L, size_t m, int row, int col, const double *B, int flip,
                             unsigned fixed_row, unsigned fixed_col) {
    int r, c;
    for (c = 0; c < 3; c++)
        for (r = 0; r < 3; r++)
            if (!(fixed_row >> r & 1u) && !(fixed_col >> c & 1u))
                L[(size_t)(3 * col + c) * m + (size_t)(3 * row + r)] +=
                    flip ? B[3 * c + r] : B[3 * r + c];
}

/* The blocks of A that the front eliminates. */
static void clothi_front_assemble(cloth_factor *f, const clothi_front *w, double *L, size_t m) {
    const cloth_pattern *p = f->p;
    int own = w->hi - w->mid, i, c;
    for (i = 0; i < own; i++) {
        unsigned fixed = f->fixed[w->mid + i];
        size_t   row = (size_t)p->row_of[p->verts[w->mid + i]];
        clothi_front_add(L, m, i, i, f->A->diag + 9 * row, 0, fixed, fixed);
        for (c = 0; c < 3; c++) {
            double *d = L + (size_t)(3 * i + c) * (m + 1);
            *d += fixed >> c & 1u ? 1.0 : f->shift;
            f->vec[3 * (w->mid + i) + c] = CLOTHI_ZERO_PIVOT * fabs(*d);
        }
    }
    for (i = w->entry; i < w[1].entry; i++) {
        const clothi_front_entry *e = f->entry + i;
        int v = e->row < own ? w->mid + e->row : f->bound[w->bound + e->row - own];
        clothi_front_add(L, m, e->row, e->col, f->A->low + 9 * (size_t)(e->slot2 >> 1),
                         e->slot2 & 1, f->fixed[v], f->fixed[w->mid + e->col]);
    }
}

/* Extend-add: the update matrix of a child into the parent's panel and update matrix. */
static void clothi_front_extend(const cloth_factor *f, const clothi_front *child, double *L,
                                double *U, size_t n, size_t m) {
    const int    *relative = f->relative + child->bound;
    const int     nb = child[1].bound - child->bound;
    const double *from = f->stack + child->update;
    int           i, j;
    for (j = 0; j < 3 * nb; j++, from += 3 * nb) {
        const size_t col = 3 * (size_t)relative[j / 3] + (size_t)(j % 3);
        double      *to = col < n ? L + col * m : U + (col - n) * (m - n) - n;
        for (i = j / 3; i < nb; i++) {
            double *t = to + 3 * (size_t)relative[i];
            t[0] += from[3 * i];
            t[1] += from[3 * i + 1];
            t[2] += from[3 * i + 2];
        }
    }
}

/* hooks NULL: serial. */
static void clothi_front_part(cloth_factor *f, const cloth_hooks *hooks, int q, double *pack) {
    const clothi_front *w = f->front + q;
    const size_t        n = (size_t)w->n, b = (size_t)w->nb;
    double *L = f->panel + w->panel, *U = f->stack + w->temp;
    int     c;
    memset(L, 0, n * (n + b) * sizeof *L);
    memset(U, 0, b * b * sizeof *U);
    clothi_front_assemble(f, w, L, n + b);
    for (c = 0; c < 2 && f->p->part[q].child[c] >= 0; c++)
        clothi_front_extend(f, f->front + f->p->part[q].child[c], L, U, n, n + b);
    clothi_front_factor(f, hooks, w, U, pack);
    if (w->update != w->temp) memmove(f->stack + w->update, U, b * b * sizeof *U);
}

/* Subtrees of subdomains. */
static void clothi_front_range(int begin, int end, int worker, void *ctx) {
    cloth_factor *f = (cloth_factor *)ctx;
    int           d, q;
    (void)worker;
    for (d = begin; d < end; d++)
        for (q = 0; q < f->p->nparts; q++)
            if (f->p->part[q].domain == d)
                clothi_front_part(f, NULL, q, f->work + (size_t)d * f->npack);
}

/* b := L^-1 b by elimination number */
static void clothi_factor_forward(cloth_factor *f, double *b) {
    double *tmp = f->vec + 3 * (size_t)f->p->n;
    int q, i, j;
    for (q = 0; q < f->p->nparts; q++) {
        const clothi_front *w = f->front + q;
        const int           n = w->n, nb = w->nb, *bound = nb ? f->bound + w->bound : NULL;
        const double       *L = f->panel + w->panel;
        double             *x = b + 3 * (size_t)w->mid;
        memset(tmp, 0, (size_t)nb * sizeof *tmp);
        for (j = 0; j < n; j++, L += n + nb) {
            const double *below = L + n;
            double s = x[j] /= L[j];
            for (i = j + 1; i < n; i++) x[i] -= s * L[i];
            for (i = 0; i < nb; i++) tmp[i] += s * below[i];
        }
        for (i = 0; i < nb; i++) b[3 * bound[i / 3] + i % 3] -= tmp[i];
    }
}

/* b := L'^-1 b */
static void clothi_factor_backward(cloth_factor *f, double *b) {
    double *tmp = f->vec + 3 * (size_t)f->p->n;
    int q, i, j;
    for (q = f->p->nparts - 1; q >= 0; q--) {
        const clothi_front *w = f->front + q;
        const int           n = w->n, nb = w->nb, *bound = nb ? f->bound + w->bound : NULL;
        double             *x = b + 3 * (size_t)w->mid;
        for (i = 0; i < nb; i++) tmp[i] = b[3 * bound[i / 3] + i % 3];
        for (j = n - 1; j >= 0; j--) {
            const double *L = f->panel + w->panel + (size_t)j * (size_t)(n + nb);
            const double  s = clothi_dot(tmp, L + n, (size_t)nb) +
                              clothi_dot(x + j + 1, L + j + 1, (size_t)(n - j - 1));
            x[j] = (x[j] - s) / L[j];
        }
    }
}

CLOTH_API cloth_status cloth_factor_solve(cloth_factor *f, const double *b, double *x) {
    int i, n;
    if (!f || !f->ready || !b || !x)
        return clothi_fail(f ? &f->hooks : NULL, CLOTH_ERR_ARGUMENT,
                           "factor: a pointer is NULL or nothing was computed");
    n = 3 * f->p->n;
    for (i = 0; i < n; i++)                 /* fixed unknowns and zero pivots give 0           */
        f->vec[i] = (unsigned)f->fixed[i / 3] >> i % 3 & 1u || !f->pivot[i]
                        ? 0 : b[3 * f->p->verts[i / 3] + i % 3];
    clothi_factor_forward(f, f->vec);
    for (i = 0; i < n; i++) f->vec[i] *= f->pivot[i];
    clothi_factor_backward(f, f->vec);
    for (i = 0; i < n; i++) x[3 * f->p->verts[i / 3] + i % 3] = f->vec[i];
    return CLOTH_OK;
}

CLOTHI_RARE_BEGIN

CLOTH_API cloth_status cloth_factor_create(const cloth_hooks *hooks, const cloth_pattern *pattern,
                                           cloth_factor **out) {
    cloth_factor *f;
    cloth_status  status;
    int           q, i, np;
    if (!out) return clothi_null(hooks, "factor: out");
    *out = NULL;
    if (!pattern) return clothi_null(hooks, "factor: pattern");
    f = (cloth_factor *)clothi_object(hooks, sizeof *f);
    if (!f) return CLOTH_ERR_MEMORY;
    f->p = pattern, np = pattern->nparts;
    f->front = (clothi_front *)clothi_alloc(hooks, (size_t)np + 2, sizeof *f->front);
    f->entry = (clothi_front_entry *)clothi_alloc(hooks, (size_t)pattern->nlow, sizeof *f->entry);
    status = f->front && f->entry ? clothi_front_lists(f) : CLOTH_ERR_MEMORY;
    if (status) {
        cloth_factor_destroy(f);
        return status;
    }
    f->relative = f->bound + f->front[np].bound;
    for (q = 0; q < np; q++) {
        for (i = f->front[q].entry; i < f->front[q + 1].entry; i++)
            f->entry[i].row = clothi_front_index(f, q, f->entry[i].row);
        for (i = f->front[q].bound; i < f->front[q + 1].bound; i++)
            f->relative[i] = clothi_front_index(f, pattern->part[q].parent, f->bound[i]);
    }
    clothi_front_layout(f);
    *out = f;
    return CLOTH_OK;
}

CLOTH_API void cloth_factor_destroy(cloth_factor *f) {
    (void)clothi_object_blocks(f, 4, 1);
}

CLOTH_API size_t cloth_factor_bytes(const cloth_factor *f) {
    return clothi_object_blocks(f, 4, 0);
}

/* Room for the numbers. */
static cloth_status clothi_factor_reserve(cloth_factor *f) {
    const size_t n = 3 * (size_t)f->p->n, packed = (size_t)(f->p->nd + 1) * f->npack;
    const size_t count = packed + f->nstack + f->front[f->p->nparts].panel + 4 * n;
    if (f->work) return CLOTH_OK;
    f->work = (double *)clothi_alloc(&f->hooks, count, sizeof(double));
    if (!f->work) return CLOTH_ERR_MEMORY;
    f->stack = f->work + packed, f->panel = f->stack + f->nstack;
    f->sign = f->panel + f->front[f->p->nparts].panel, f->vec = f->sign + n;
    f->pivot = (signed char *)(f->vec + 2 * n), f->fixed = (unsigned char *)f->pivot + n;
    return CLOTH_OK;
}

/* Counts pivots; the first bad one in the order of elimination. */
static cloth_status clothi_factor_judge(cloth_factor *f, cloth_factor_report *rep) {
    const int n = 3 * f->p->n;
    int       i, q;
    f->first_bad = -1;
    for (i = 0; i < n; i++) {               /* the first negative one, else the first zero     */
        rep->negative += f->pivot[i] < 0;
        rep->zero += f->pivot[i] == 0;
        if (f->pivot[i] < 0 && rep->negative == 1) f->first_bad = i;
        if (f->pivot[i] == 0 && f->first_bad < 0) f->first_bad = i;
    }
    for (q = 0; q < f->p->nparts; q++) {
        const clothi_front *w = f->front + q;
        for (i = 0; i < w->n; i++)
            if (!clothi_finite(f->panel[w->panel + (size_t)i * (size_t)(w->n + w->nb + 1)]))
                return CLOTH_ERR_NONFINITE;
    }
    if (f->first_bad < 0) return CLOTH_OK;
    rep->bad_vertex = f->p->verts[f->first_bad / 3];
    rep->bad_axis = f->first_bad % 3;
    return CLOTH_ERR_NUMERIC;
}

CLOTH_API cloth_status cloth_factor_compute(cloth_factor *f, const cloth_matrix *A,
                                            const unsigned char *fixed, double shift,
                                            cloth_factor_report *report) {
    cloth_factor_report  rep;
    const cloth_pattern *p;
    cloth_status status;
    int          e, q;
    memset(&rep, 0, sizeof rep);
    rep.bad_vertex = rep.bad_axis = -1;
    if (report) *report = rep;
    if (!f || !A || A->p != f->p || !clothi_finite(shift))
        return clothi_fail(f ? &f->hooks : NULL, CLOTH_ERR_ARGUMENT,
                           "factor: a pointer is NULL, of another pattern, or shift = %g", shift);
    status = clothi_factor_reserve(f);
    if (status != CLOTH_OK) return status;
    p = f->p, f->A = A, f->shift = shift;
    for (e = 0; e < p->n; e++)
        f->fixed[e] = (unsigned char)(fixed ? fixed[p->verts[e]] & 7u : 0u);
    clothi_for(&f->hooks, p->nd, 1, clothi_front_range, f);
    for (q = 0; q < p->nparts; q++)
        if (p->part[q].domain < 0)
            clothi_front_part(f, &f->hooks, q, f->work + (size_t)p->nd * f->npack);
    status = clothi_factor_judge(f, &rep);
    f->ready = status != CLOTH_ERR_NONFINITE;
    rep.flops = f->flops;
    rep.entries = (double)f->front[p->nparts].panel;
    if (report) *report = rep;
    return status;
}

CLOTH_API double cloth_factor_direction(cloth_factor *f, double *d) {
    int    n, i;
    double norm2;
    if (!f || !f->ready || !d) return 0;
    n = 3 * f->p->n;
    memset(d, 0, (size_t)n * sizeof *d);
    if (f->first_bad < 0) return 0;
    memset(f->vec, 0, (size_t)n * sizeof *f->vec);
    f->vec[f->first_bad] = 1;
    clothi_factor_backward(f, f->vec);
    norm2 = clothi_dot(f->vec, f->vec, (size_t)n);
    for (i = 0; i < n; i++) d[3 * f->p->verts[i / 3] + i % 3] = f->vec[i] / sqrt(norm2);
    return f->pivot[f->first_bad] / norm2;
}

/* --- the solver's calls --- */

static int clothi_by_factor(cloth_linear_solver *s, const double *r, double *z) {
    return cloth_factor_solve(s->factor, r, z) != CLOTH_OK;
}

/* The factor of A without its blocks outside the pattern. */
static cloth_status clothi_solver_factor(cloth_linear_solver *s, const cloth_matrix *A,
                                         const unsigned char *fixed) {
    cloth_status status = CLOTH_OK;
    if (!s->factor) status = cloth_factor_create(&s->hooks, s->p, &s->factor);
    return status ? status : cloth_factor_compute(s->factor, A, fixed, 0, NULL);
}

/* What a solve is about; x [n x 3] is what is read of b. */
static cloth_status clothi_linear_begin(cloth_linear_solver *s, const cloth_matrix *A,
                                        const double *b, double *x, const cloth_linear_options *o,
                                        clothi_cg *g) {
    const size_t n = 3 * (size_t)s->p->n;
    size_t       i;
    s->A = A, s->to = x, s->fixed = o->fixed, s->radius_on = o->radius > 0;
    memset(g, 0, sizeof *g);
    for (i = 0; i < n; i++) x[i] = s->fixed && s->fixed[i / 3] >> (i % 3) & 1 ? 0 : b[i];
    if (clothi_find_nonfinite(x, n) >= 0) return CLOTH_ERR_NONFINITE;
    g->tolerance = clothi_max(o->tolerance, CLOTHI_LEAST_TOLERANCE);
    g->radius = o->radius;
    g->most = o->max_iterations > 0 ? o->max_iterations : CLOTHI_CG_CAP;
    return clothi_solver_reserve(s, A);
}

CLOTH_API cloth_status cloth_linear_solve(cloth_linear_solver *s, const cloth_matrix *A,
                                          const double *b, double *x,
                                          const cloth_linear_options *options,
                                          cloth_linear_report *report) {
    cloth_linear_options o = cloth_linear_options_default();
    cloth_linear_report  r;
    clothi_cg            g;
    cloth_status         status;
    size_t               n3;
    int                  bad;
    memset(&r, 0, sizeof r);
    if (report) *report = r;
    if (options) o = *options;
    if (!s) return CLOTH_ERR_ARGUMENT;
    n3 = 3 * (size_t)s->p->n;
    if (!A || !b || !x || A->p != s->p)
        return clothi_fail(&s->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_linear_solve: A, b or x is NULL, or A of another pattern");
    if (o.method < CLOTH_LINEAR_AUTO || o.method > CLOTH_LINEAR_CHOLESKY ||
        !(o.tolerance >= 0) || !(o.radius >= 0 && clothi_finite(o.radius)) || o.max_iterations < 0)
        return clothi_fail(&s->hooks, CLOTH_ERR_ARGUMENT, "cloth_linear_solve: method %i, tolerance"
                           " %g, radius %g, max_iterations %i: one is out of range",
                           (int)o.method, o.tolerance, o.radius, o.max_iterations);
    status = clothi_linear_begin(s, A, b, x, &o, &g);
    if (!status && o.method == CLOTH_LINEAR_CHOLESKY) status = clothi_solver_factor(s, A, o.fixed);
    if (!status)                            /* CHOLESKY: blocks outside the pattern count too  */
        status = o.method == CLOTH_LINEAR_JACOBI     ? clothi_plain_cg(s, clothi_jacobi, &g)
                 : o.method == CLOTH_LINEAR_CHOLESKY ? clothi_plain_cg(s, clothi_by_factor, &g)
                                                     : clothi_sgs_solve(s, &g);
    if (status == CLOTH_ERR_NUMERIC) {      /* the caller's matrix is not worth a search       */
        g.negative = 1, g.c0 = 0, g.rr = 1;
        status = CLOTH_OK;
        memset(x, 0, n3 * sizeof(double));
    }
    bad = clothi_find_nonfinite(x, n3) >= 0;
    if (!(g.c0 > 0))                        /* CG has not met all of A                         */
        bad |= clothi_find_nonfinite(A->diag, clothi_matrix_doubles(A)) >= 0 ||
               clothi_find_nonfinite(A->extra, 9 * (size_t)A->ne) >= 0;
    if (!status && bad) status = CLOTH_ERR_NONFINITE;
    if (status) {
        memset(x, 0, n3 * sizeof(double));
        return status;
    }
    r.iterations = g.it, r.factorizations = o.method == CLOTH_LINEAR_CHOLESKY;
    r.negative = g.negative, r.hit = g.hit;
    r.residual = g.c0 > 0 ? sqrt(g.rr / g.c0) : clothi_max(g.rr, 0);
    r.decrease = g.Q;
    if (report) *report = r;
    return CLOTH_OK;
}

/* ===== [8.1] MODEL ===========================================================================
 *
 *      desc  --check-->  mesh  -->  topology  -->  rest shape X  -->  stencils  -->  pattern
 *                                                                        |
 *                             elements sorted by solver domain, eight to a batch
 *
 * Everything here is constant after create. A stencil is the list of vertices that one element
 * couples: 2 of a spring, 3 of a triangle, 4 of a hinge. Batches hold eight elements of one
 * kind; no batch mixes two domains of the solver's dissection, so that domains can be assembled
 * side by side without touching the same block (elements across a separator come last).
 * checked: tests/test_desc.c, tests/test_ladder.c
 */

#define CLOTHI_COOKIE      0xC107u
#define CLOTHI_CHUNK       16               /* batches that a range of the parallel loop takes */
#define CLOTHI_VERTICES    512              /* vertices that a range takes                     */
#define CLOTHI_MAX_SUBSTEPS 1000000

/* Elements of one kind, eight to a batch. */
typedef struct clothi_group {
    int  kind, width, count, nbatch;        /* width: vertices of an element                   */
    int  ndomain;                           /* domains of the solver, then the shared rest     */
    int  domain[CLOTHI_DOMAINS + 2];        /* first batch of each; behind the last: nbatch    */
    int *id;                                /* [nbatch x 8] element, -1: an unused lane        */
    int *vert;                              /* [nbatch x width x 8]                            */
    int *slot;                              /* [nbatch x pairs x 8] off-diagonal matrix slots  */
    int  force;                             /* offset of its forces in the sim's force buffer  */
} clothi_group;

#define CLOTHI_ASPECTS 10                   /* clothi_aspects                                  */

struct cloth_model {
    cloth_hooks hooks;
    cloth_desc  desc;                       /* scalars only: its pointers are cleared          */
    int nv, nf, nregions, nparts;
    double *x_rest, *x, *v;                 /* [nv x 3]; x may be x_rest, v NULL: 0            */
    int    *faces;                          /* [nf x 3]                                        */
    int    *part, *region;                  /* [nf]                                            */
    double *X;                              /* [nf x 3 x 2]                                    */
    double *theta0;                         /* [nh]                                            */
    double *vertex_mass;                    /* [nv] or NULL                                    */
    cloth_material *material;               /* [nregions]                                      */
    unsigned char  *pin;                    /* [nv] axes                                       */
    int *tie;                               /* [nv x 3] leader of each axis, -1; or NULL       */
    cloth_topology *topology;
    cloth_pattern  *pattern;                /* NULL for LEAPFROG                               */
    clothi_group    membrane, bend;         /* bend.count == 0 for CLOTH_BEND_NONE             */
    int *gather_start;                      /* [nv+1]                                          */
    int *gather_mid;                        /* [nv] where the membrane's entries end           */
    int *wing;                              /* [membrane batches x 3 x 8] hinges, or NULL      */
    int *gather;                            /* offsets of x components in the force buffer     */
    int  force_size;                        /* doubles in the force buffer                     */
    uint64_t hash, aspect[CLOTHI_ASPECTS];  /* of all, and of its aspects                      */
    const void *block[22];                  /* all these arrays, those of the mesh first       */
    int  nblock, nmesh, lost;               /* lost: one could not be made                     */
};

CLOTH_API cloth_desc cloth_desc_default(void) {
    cloth_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = CLOTHI_COOKIE, d.rest_angle = CLOTH_REST_ANGLE_TEMPLATE;
    d.material = cloth_material_default(), d.membrane = CLOTH_MEMBRANE_STVK;
    d.bend = CLOTH_BEND_HINGE, d.integrator = CLOTH_INTEGRATOR_EULER;
    d.contact = CLOTH_CONTACT_NONE, d.gravity[1] = -9.81;
    d.air_density = CLOTH_DEFAULT_AIR_DENSITY, d.drag = CLOTH_DEFAULT_DRAG;
    d.lift = CLOTH_DEFAULT_LIFT, d.max_attachments = CLOTH_DEFAULT_ATTACHMENTS;
    d.tolerance = CLOTH_DEFAULT_TOLERANCE, d.cg_tolerance = CLOTH_DEFAULT_CG_TOLERANCE;
    d.linear = CLOTH_LINEAR_AUTO, d.sleep = CLOTH_DEFAULT_SLEEP;
    return d;
}

/* --- what a desc may say --- */

static cloth_status clothi_check_holds(const cloth_hooks *hooks, const cloth_desc *d) {
    const double      last = d->nv - 1.0;
    const clothi_rule pin[2] = {CLOTHI_RULE(cloth_pin, vertex, 0, 0, 0, last),
                                CLOTHI_RULE(cloth_pin, axes, 0, 0, 1, CLOTH_AXIS_ALL)};
    const clothi_rule tie[3] = {CLOTHI_RULE(cloth_tie, leader, 0, 0, 0, last),
                                CLOTHI_RULE(cloth_tie, follower, 0, 0, 0, last),
                                CLOTHI_RULE(cloth_tie, axes, 0, 0, 1, CLOTH_AXIS_ALL)};
    char         name[32];
    int          i;
    cloth_status status = CLOTH_OK;
    if (d->nties > 0 && d->integrator == CLOTH_INTEGRATOR_LEAPFROG)
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED,
                           "desc.nties = %i: CLOTH_INTEGRATOR_LEAPFROG has no ties", d->nties);
    for (i = 0; i < d->npins && !status; i++)
        status = clothi_check_rules(hooks, clothi_member(name, "desc.pins", i), d->pins + i, pin,
                                    2);
    for (i = 0; i < d->nties && !status; i++) {
        const char *who = clothi_member(name, "desc.ties", i);
        status = clothi_check_rules(hooks, who, d->ties + i, tie, 3);
        if (!status && d->ties[i].leader == d->ties[i].follower)
            status = clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%sleader = %i is its follower", who,
                                 d->ties[i].leader);
    }
    return status;
}

static cloth_status clothi_check_mesh(const cloth_hooks *hooks, const cloth_desc *d) {
    cloth_mesh_report faults;
    cloth_status      status;
    status = cloth_mesh_check(hooks, d->nv, d->x_rest, d->nf, d->faces, d->X, &faults);
    if (!status) status = clothi_check_vector(hooks, "desc.x", d->x, 3 * d->nv);
    if (!status) status = clothi_check_vector(hooks, "desc.v", d->v, 3 * d->nv);
    if (!status)
        status = clothi_check_each(hooks, "desc.vertex_mass", d->vertex_mass, d->nv, 0, 1);
    if (!status)
        status = clothi_check_indices(hooks, CLOTH_ERR_ARGUMENT, "desc.", "part", d->part, d->nf, 1,
                                      d->nf);
    if (status) return status;
    return clothi_check_indices(hooks, CLOTH_ERR_ARGUMENT, "desc.", "region", d->region, d->nf, 1,
                                d->nregions > 0 ? d->nregions : 1);
}

/* Whether sums and quotients are rounded as written: not where a flag that no macro shows makes
 * (a + b) - a b, or a / 3 a product with a third. */
static int clothi_ieee(void) {
#ifndef CLOTH_ALLOW_FAST_MATH
    volatile double one = 1, tiny = 1e-20, five = 5;        /* no constants to the compiler */
    const double    a = one, b = tiny;
    if ((a + b) - a > 0 || five / 3 < 1.6666666666666667) return 0;
#endif
    return 1;
}

/* Every refusal that needs no allocation of the model's own. */
static cloth_status clothi_check_desc(const cloth_desc *d) {
    static const clothi_rule rule[] = {
        CLOTHI_RULE(cloth_desc, gravity, 3, 0, -CLOTHI_HUGE, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, wind, 3, 0, -CLOTHI_HUGE, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, air_density, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, drag, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, lift, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, tolerance, 1, CLOTHI_OVER, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, sleep, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_desc, cg_tolerance, 1, CLOTHI_OVER | CLOTHI_UNDER, 0, 1),
        CLOTHI_RULE(cloth_desc, substeps, 0, 0, 0, CLOTHI_MAX_SUBSTEPS),
        CLOTHI_RULE(cloth_desc, max_newton, 0, 0, 0, 0x7fffffff),
        CLOTHI_RULE(cloth_desc, max_attachments, 0, 0, 0, 0xffff),
        CLOTHI_RULE(cloth_desc, membrane, 0, 0, CLOTH_MEMBRANE_SPRINGS, CLOTH_MEMBRANE_STVK),
        CLOTHI_RULE(cloth_desc, bend, 0, 0, CLOTH_BEND_NONE, CLOTH_BEND_HINGE),
        CLOTHI_RULE(cloth_desc, integrator, 0, 0, CLOTH_INTEGRATOR_LEAPFROG, CLOTH_INTEGRATOR_BDF2),
        CLOTHI_RULE(cloth_desc, contact, 0, 0, CLOTH_CONTACT_NONE, CLOTH_CONTACT_SELF),
        CLOTHI_RULE(cloth_desc, rest_angle, 0, 0, CLOTH_REST_ANGLE_TEMPLATE, CLOTH_REST_ANGLE_FLAT),
        CLOTHI_RULE(cloth_desc, linear, 0, 0, CLOTH_LINEAR_AUTO, CLOTH_LINEAR_CHOLESKY),
        CLOTHI_RULE(cloth_desc, nregions, 0, 0, 0, 0x7fffffff),
        CLOTHI_RULE(cloth_desc, npins, 0, 0, 0, 0x7fffffff),
        CLOTHI_RULE(cloth_desc, nties, 0, 0, 0, 0x7fffffff),
        CLOTHI_RULE(cloth_desc, nv, 0, 0, 3, CLOTH_MAX_COUNT),
        CLOTHI_RULE(cloth_desc, nf, 0, 0, 1, CLOTH_MAX_COUNT)};
    const struct { const char *name; const void *list; int n; } given[] = {
        {"desc.x_rest", d->x_rest, 1}, {"desc.faces", d->faces, 1},
        {"desc.materials", d->materials, d->nregions}, {"desc.pins", d->pins, d->npins},
        {"desc.ties", d->ties, d->nties}};
    const cloth_hooks *hooks = &d->hooks;
    cloth_status       status;
    int                i;
    if ((d->hooks.allocator.alloc == NULL) != (d->hooks.allocator.free == NULL))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "desc.hooks.allocator: set both alloc and free, or neither");
    if (d->hooks.parallel.run && d->hooks.parallel.max_workers < 1)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "desc.hooks.parallel.max_workers = %i must be at least 1",
                           d->hooks.parallel.max_workers);
    if (!clothi_ieee())
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "compiled for other than IEEE arithmetic: "
                           "-funsafe-math-optimizations?");
    if (d->bend == CLOTH_BEND_SHELL)
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED,
                           "desc.bend = CLOTH_BEND_SHELL is not built in this version");
    status = clothi_check_rules(hooks, "desc.", d, rule, sizeof rule / sizeof *rule);
    for (i = 0; i < 5 && !status; i++)
        if (given[i].n > 0 && !given[i].list) status = clothi_null(hooks, given[i].name);
    if (!status) status = clothi_check_mesh(hooks, d);
    if (!status) status = clothi_check_holds(hooks, d);
    for (i = 0; (i < d->nregions || i == 0) && !status; i++)
        status = cloth_material_check(hooks, d->nregions ? d->materials + i : &d->material, i);
    return status;
}

/* --- copies --- */

CLOTHI_OUTLINE static void *clothi_copy(const cloth_hooks *hooks, const void *from, size_t count,
                                        size_t size) {
    void *to = clothi_alloc(hooks, count, size);
    if (to && from) memcpy(to, from, count * size);
    return to;
}

/* An array of the model, which is freed and counted with it; from NULL: of zeros. */
static void *clothi_model_array(cloth_model *m, const void *from, size_t count, size_t size) {
    void *to = clothi_copy(&m->hooks, from, count, size);
    m->lost |= !to;
    if (to) m->block[m->nblock++] = to;
    return to;
}

static cloth_status clothi_model_copy(cloth_model *m, const cloth_desc *d) {
    size_t nv = (size_t)m->nv, nf = (size_t)m->nf;
    int    i;
    m->x_rest = (double *)clothi_model_array(m, d->x_rest, 3 * nv, sizeof(double));
    m->x = d->x ? (double *)clothi_model_array(m, d->x, 3 * nv, sizeof(double)) : m->x_rest;
    m->faces = (int *)clothi_model_array(m, d->faces, 3 * nf, sizeof(int));
    m->part = (int *)clothi_model_array(m, d->part, nf, sizeof(int));
    m->region = (int *)clothi_model_array(m, d->region, nf, sizeof(int));
    m->X = (double *)clothi_model_array(m, d->X, 6 * nf, sizeof(double));
    m->pin = (unsigned char *)clothi_model_array(m, NULL, nv, 1);
    m->material = (cloth_material *)clothi_model_array(
        m, d->nregions > 0 ? d->materials : &d->material, (size_t)m->nregions,
        sizeof(cloth_material));
    if (d->v) m->v = (double *)clothi_model_array(m, d->v, 3 * nv, sizeof(double));
    if (d->vertex_mass)
        m->vertex_mass = (double *)clothi_model_array(m, d->vertex_mass, nv, sizeof(double));
    if (m->lost) return CLOTH_ERR_MEMORY;
    for (i = 0; i < d->npins; i++)
        m->pin[d->pins[i].vertex] =
            (unsigned char)(m->pin[d->pins[i].vertex] | d->pins[i].axes);
    for (i = 0; i < m->nf; i++)
        if (m->part[i] + 1 > m->nparts) m->nparts = m->part[i] + 1;
    if (!d->X) return cloth_flatten(m->nv, m->x_rest, m->nf, m->faces, m->X);
    return CLOTH_OK;
}

/* Rest area of face f; sign as the corners turn. */
CLOTHI_OUTLINE static double clothi_rest_area(const double *X, int f) {
    const double *c = X + 6 * (size_t)f;
    return 0.5 * ((c[2] - c[0]) * (c[5] - c[1]) - (c[4] - c[0]) * (c[3] - c[1]));
}

/* A mesh may pass every check and still be too small or large for its areas, or their inverses;
 * the same of masses lumped from `material`, NULL: they are given. */
static cloth_status clothi_check_areas(const cloth_model *m, const char *name, const double *X,
                                       const cloth_material *material) {
    int f;
    for (f = 0; f < m->nf; f++) {
        const double area = clothi_rest_area(X, f);
        const double mass = material ? area * material[m->region[f]].density / 3 : 1;
        if (!(area > 1e-300 && area < 1e300))
            return clothi_fail(&m->hooks, CLOTH_ERR_MESH, "%s: triangle %i has rest area %g, not > "
                               "0 and in the range of doubles: choose other units", name, f, area);
        if (!(mass > 1e-300 && mass < 1e300))
            return clothi_fail(&m->hooks, CLOTH_ERR_ARGUMENT, "material[%i].density: triangle %i "
                               "has masses of %g kg: choose other units", m->region[f], f, mass);
    }
    return CLOTH_OK;
}

/* Leaders are followed to their end, so that a leader never follows on the same axis. */
static cloth_status clothi_model_ties(cloth_model *m, const cloth_desc *d) {
    int i, k;
    if (d->nties == 0) return CLOTH_OK;
    m->tie = (int *)clothi_model_array(m, NULL, 3 * (size_t)m->nv, sizeof(int));
    if (!m->tie) return CLOTH_ERR_MEMORY;
    for (i = 0; i < 3 * m->nv; i++) m->tie[i] = -1;
    for (i = 0; i < d->nties; i++)
        for (k = 0; k < 3; k++) {
            int *lead = m->tie + 3 * d->ties[i].follower + k;
            if (!(d->ties[i].axes & (1u << k))) continue;
            if (*lead >= 0 && *lead != d->ties[i].leader)
                return clothi_fail(&m->hooks, CLOTH_ERR_ARGUMENT,
                                   "desc.ties[%i]: vertex %i already follows %i on that axis", i,
                                   d->ties[i].follower, *lead);
            *lead = d->ties[i].leader;
        }
    for (i = 0; i < 3 * m->nv; i++) {
        int lead = m->tie[i], steps = 0, at = i, next;
        while (lead >= 0 && m->tie[3 * lead + i % 3] >= 0 && steps++ <= m->nv)
            lead = m->tie[3 * lead + i % 3];
        if (steps > m->nv)
            return clothi_fail(&m->hooks, CLOTH_ERR_ARGUMENT,
                               "desc.ties: vertex %i follows itself", i / 3);
        for (; m->tie[at] != lead; at = next) {         /* nobody goes that way again          */
            next = 3 * m->tie[at] + i % 3;
            m->tie[at] = lead;
        }
    }
    for (i = 0; i < 3 * m->nv; i++)         /* a pin on a follower is one on its leader */
        if (m->tie[i] >= 0 && (m->pin[i / 3] >> (i % 3) & 1)) {
            m->pin[i / 3] = (unsigned char)(m->pin[i / 3] & ~(1u << (i % 3)));
            m->pin[m->tie[i]] = (unsigned char)(m->pin[m->tie[i]] | 1u << (i % 3));
        }
    return CLOTH_OK;
}

/* Rest angles of the template; quadratic bending knows only flat ones. */
static cloth_status clothi_model_angles(cloth_model *m) {
    const cloth_topology *t = m->topology;
    int h, k;
    m->theta0 = (double *)clothi_model_array(m, NULL, (size_t)t->nh, sizeof(double));
    if (!m->theta0) return CLOTH_ERR_MEMORY;
    for (h = 0; h < t->nh && m->desc.rest_angle == CLOTH_REST_ANGLE_TEMPLATE; h++) {
        double x[12];
        for (k = 0; k < 12; k++) x[k] = m->x_rest[3 * t->hinges[4 * h + k / 3] + k % 3];
        m->theta0[h] = cloth_dihedral(x);
        if (m->desc.bend == CLOTH_BEND_QUADRATIC && fabs(m->theta0[h]) > 1e-9)
            return clothi_fail(&m->hooks, CLOTH_ERR_UNSUPPORTED,
                               "desc.bend = CLOTH_BEND_QUADRATIC needs a flat rest shape, but "
                               "hinge %i rests at %g rad: use CLOTH_BEND_HINGE or "
                               "CLOTH_REST_ANGLE_FLAT", h, m->theta0[h]);
    }
    return CLOTH_OK;
}

/* --- stencils, pattern, batches --- */

/* Vertices of element i of a kind. */
static const int *clothi_stencil(const cloth_model *m, int kind, int i) {
    if (kind == CLOTHI_SPRING) return m->topology->edges + 2 * i;
    if (kind == CLOTHI_TRIANGLE) return m->faces + 3 * i;
    return m->topology->hinges + 4 * i;
}

/* The pattern of the Hessian: a block for each pair of vertices of a stencil; with ties, the
 * leaders join the stencil, since their rows take the followers' entries. */
static cloth_status clothi_model_pattern(cloth_model *m) {
    const int    first = m->membrane.count, nelem = first + m->bend.count, per = m->tie ? 16 : 4;
    int         *start = (int *)clothi_alloc(&m->hooks, (size_t)nelem + 1, sizeof(int));
    int         *vertex = (int *)clothi_alloc(&m->hooks, (size_t)nelem * (size_t)per, sizeof(int));
    int          i, k, a, n = 0;
    cloth_status status = CLOTH_ERR_MEMORY;
    for (i = 0; i < nelem && start && vertex; i++, start[i] = n) {
        const clothi_group *g = i < first ? &m->membrane : &m->bend;
        const int          *v = clothi_stencil(m, g->kind, i < first ? i : i - first);
        for (k = 0; k < g->width; k++) vertex[n++] = v[k];
        for (k = 0; m->tie && k < 3 * g->width; k++) {
            int lead = m->tie[3 * v[k / 3] + k % 3];
            for (a = start[i]; a < n && vertex[a] != lead; a++) {}
            if (lead >= 0 && a == n) vertex[n++] = lead;
        }
    }
    if (start && vertex)
        status = cloth_pattern_create(&m->hooks, m->nv, nelem, start, vertex, m->x_rest,
                                      &m->pattern);
    clothi_free(&m->hooks, vertex);
    clothi_free(&m->hooks, start);
    return status;
}

static int clothi_group_pairs(const clothi_group *g) { return g->width * (g->width - 1) / 2; }

/* Domain of element e: the one that holds its vertices, but for one on a separator; with two
 * there it writes to a block that others may write to: ndomain. */
static int clothi_element_domain(const cloth_model *m, const clothi_group *g, int e) {
    const int *v = clothi_stencil(m, g->kind, e);
    int        k, domain = -1, outside = 0;
    if (!m->pattern) return 0;
    for (k = 0; k < g->width; k++) {
        int d = clothi_pattern_domain(m->pattern, v[k]);
        if (d < 0 ? outside++ > 0 : domain >= 0 && d != domain) return g->ndomain;
        if (d >= 0) domain = d;
    }
    return domain < 0 ? g->ndomain : domain;
}

/* Sorts elements by domain (counting sort, in element order), pads each domain to whole batches
 * by repeating its last element in lanes whose id is -1. */
static cloth_status clothi_group_build(cloth_model *m, clothi_group *g) {
    enum { L = CLOTHI_LANES };
    const int pairs = clothi_group_pairs(g);
    int       d, e, i, k, n, next[CLOTHI_DOMAINS + 2] = {0};
    g->ndomain = m->pattern ? m->pattern->nd : 1;
    for (e = 0; e < g->count; e++) next[clothi_element_domain(m, g, e)]++;
    for (d = 0; d <= g->ndomain; d++) {
        g->domain[d + 1] = g->domain[d] + (next[d] + L - 1) / L;
        next[d] = g->domain[d] * L;
    }
    g->nbatch = g->domain[g->ndomain + 1];
    n = g->nbatch * L;
    g->id = (int *)clothi_model_array(m, NULL, (size_t)n, sizeof(int));
    g->vert = (int *)clothi_model_array(m, NULL, (size_t)n * (size_t)g->width, sizeof(int));
    if (m->pattern)
        g->slot = (int *)clothi_model_array(m, NULL, (size_t)n * (size_t)pairs, sizeof(int));
    if (m->lost) return CLOTH_ERR_MEMORY;
    for (i = 0; i < n; i++) g->id[i] = -1;
    for (e = 0; e < g->count; e++) g->id[next[clothi_element_domain(m, g, e)]++] = e;
    for (i = 0, e = 0; i < n; i++) {
        const int *v = clothi_stencil(m, g->kind, e = g->id[i] < 0 ? e : g->id[i]);
        for (k = 0; k < g->width; k++) g->vert[(i / L * g->width + k) * L + i % L] = v[k];
        for (k = 0; m->pattern && k < pairs; k++)
            g->slot[(i / L * pairs + k) * L + i % L] =
                clothi_pattern_slot(m->pattern, v[clothi_pair[k][0]], v[clothi_pair[k][1]]);
    }
    return CLOTH_OK;
}

/* For each vertex the places of its element forces: forces are summed by gathering, in an order
 * that no worker count changes. */
static cloth_status clothi_model_gather(cloth_model *m) {
    enum { L = CLOTHI_LANES };
    const int middle = m->membrane.nbatch * m->membrane.width * L;
    const int n = middle + m->bend.nbatch * m->bend.width * L;
    int      *key = (int *)clothi_alloc(&m->hooks, (size_t)n, sizeof(int)), i, k;
    m->gather_start = (int *)clothi_model_array(m, NULL, (size_t)m->nv + 2, sizeof(int));
    m->gather_mid = (int *)clothi_model_array(m, NULL, (size_t)m->nv, sizeof(int));
    m->gather = (int *)clothi_model_array(m, NULL, (size_t)n, sizeof(int));
    m->bend.force = 3 * middle, m->force_size = 3 * n;
    if (m->lost || !key) {
        clothi_free(&m->hooks, key);
        return CLOTH_ERR_MEMORY;
    }
    for (i = 0; i < n; i++) {   /* unused lanes: behind all vertices */
        const clothi_group *g = i < middle ? &m->membrane : &m->bend;
        const int           at = i < middle ? i : i - middle, each = g->width * L;
        key[i] = g->id[at / each * L + at % L] < 0 ? m->nv : g->vert[at];
    }
    clothi_sort_by(n, m->nv + 1, key, NULL, m->gather, m->gather_start);
    for (i = 0; i < m->nv; i++) {
        for (k = m->gather_start[i]; k < m->gather_start[i + 1] && m->gather[k] < middle; k++) {}
        m->gather_mid[i] = k;
    }
    for (i = 0; i < n; i++) m->gather[i] = m->gather[i] / L * 3 * L + m->gather[i] % L;
    clothi_free(&m->hooks, key);
    return CLOTH_OK;
}

/* For each triangle lane and corner the bend group's lane of the hinge opposite; at a boundary the
 * number behind them all. */
static cloth_status clothi_model_wings(cloth_model *m) {
    const clothi_group   *g = &m->membrane, *b = &m->bend;
    const cloth_topology *t = m->topology;
    int      *place, i, k;
    place = (int *)clothi_alloc(&m->hooks, (size_t)t->ne, sizeof(int));
    m->wing = (int *)clothi_model_array(m, NULL, (size_t)g->nbatch * 3 * CLOTHI_LANES, sizeof(int));
    if (place && m->wing) {
        for (i = 0; i < t->ne; i++) place[i] = b->nbatch * CLOTHI_LANES;
        for (i = 0; i < b->nbatch * CLOTHI_LANES; i++)
            if (b->id[i] >= 0) place[t->hinge_edge[b->id[i]]] = i;
        for (i = 0; i < g->nbatch * CLOTHI_LANES; i++)
            for (k = 0; k < 3 && g->id[i] >= 0; k++)
                m->wing[(i / CLOTHI_LANES * 3 + k) * CLOTHI_LANES + i % CLOTHI_LANES] =
                    place[t->face_edges[3 * g->id[i] + (k + 1) % 3]];
    }
    clothi_free(&m->hooks, place);
    return place && m->wing ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

static cloth_status clothi_model_elements(cloth_model *m) {
    const cloth_desc *d = &m->desc;
    cloth_status      status = CLOTH_OK;
    m->membrane.kind = d->membrane == CLOTH_MEMBRANE_STVK ? CLOTHI_TRIANGLE : CLOTHI_SPRING;
    m->membrane.width = m->membrane.kind == CLOTHI_TRIANGLE ? 3 : 2;
    m->membrane.count = m->membrane.kind == CLOTHI_TRIANGLE ? m->nf : m->topology->ne;
    m->bend.kind = d->bend == CLOTH_BEND_QUADRATIC ? CLOTHI_QUADRATIC : CLOTHI_HINGE;
    m->bend.width = 4;
    m->bend.count = d->bend == CLOTH_BEND_NONE ? 0 : m->topology->nh;
    if (9 * (double)m->nf + 6 * (double)m->topology->ne + 12 * (double)m->bend.count > 2e9)
        return clothi_fail(&m->hooks, CLOTH_ERR_CAPACITY, "desc.nf = %i: the force buffer of a "
                           "model holds at most 2e9 numbers", m->nf);
    if (m->bend.count) status = clothi_model_angles(m);
    m->nmesh = m->nblock;
    if (!status && d->integrator != CLOTH_INTEGRATOR_LEAPFROG) status = clothi_model_pattern(m);
    if (!status) status = clothi_group_build(m, &m->membrane);
    if (!status) status = clothi_group_build(m, &m->bend);
    if (!status) status = clothi_model_gather(m);
    if (!status && d->integrator == CLOTH_INTEGRATOR_LEAPFROG && m->bend.count &&
        m->membrane.kind == CLOTHI_TRIANGLE)
        status = clothi_model_wings(m);
    return status;
}

/* --- hash, create, destroy --- */

/* What decides whether a snapshot fits: all of the model that steps read, and what reset goes back
 * to. In a snapshot's head side by side, for a sentence that says what differs. */
static const char *const clothi_aspects[] = {"mesh", "parts", "regions", "rest shape", "ties",
    "start (x, v, pins, masses, materials, gravity or wind)", "membrane, bending or integrator",
    "contact rung",
    "substeps, max_newton, max_attachments, tolerances, linear solver or sleep", "air"};

static void clothi_model_hash(cloth_model *m) {
    const cloth_desc *d = &m->desc;
    const size_t      nv = (size_t)m->nv, nf = (size_t)m->nf;
    const int32_t     count[3] = {m->nv, m->nf, m->topology->nh};
    const int32_t     rungs[3] = {(int32_t)d->membrane, (int32_t)d->bend, (int32_t)d->integrator};
    const int32_t     rest_angle = (int32_t)d->rest_angle;
    const int32_t     whole[4] = {d->substeps, d->max_newton, d->max_attachments,
                                  (int32_t)d->linear};
    const int32_t     contact = (int32_t)d->contact, wind_on = d->wind_on != 0;
    const double      real[5] = {d->tolerance, d->cg_tolerance, d->air_density, d->drag, d->lift};
    const struct { const void *data; size_t size; int aspect; } part[] = {
        {count, sizeof count, 0}, {m->faces, 3 * nf * sizeof(int), 0},
        {m->part, nf * sizeof(int), 1}, {m->region, nf * sizeof(int), 2},
        {&m->nregions, sizeof m->nregions, 2},
        {m->x_rest, 3 * nv * sizeof(double), 3}, {m->X, 6 * nf * sizeof(double), 3},
        {&rest_angle, sizeof rest_angle, 3},
        {m->vertex_mass, m->vertex_mass ? nv * sizeof(double) : 0, 5},
        {m->tie, m->tie ? 3 * nv * sizeof(int) : 0, 4}, {m->x, 3 * nv * sizeof(double), 5},
        {m->v, 3 * nv * sizeof(double), 5}, {m->pin, nv, 5}, {d->gravity, sizeof d->gravity, 5},
        {&wind_on, sizeof wind_on, 5}, {d->wind, sizeof d->wind, 5}, {rungs, sizeof rungs, 6},
        {&contact, sizeof contact, 7}, {whole, sizeof whole, 8}, {real, 2 * sizeof *real, 8},
        {real + 2, 3 * sizeof *real, 9},
        {&d->sleep, d->sleep > 0 ? sizeof d->sleep : 0, 8}};
    size_t i;
    for (i = 0; i < CLOTHI_ASPECTS; i++) m->aspect[i] = 0xcbf29ce484222325u;
    for (i = 0; i < sizeof part / sizeof *part; i++)
        m->aspect[part[i].aspect] =
            clothi_hash(m->aspect[part[i].aspect], part[i].data, part[i].size);
    for (i = 0; i < (size_t)m->nregions; i++)           /* without what pads the struct        */
        m->aspect[5] = clothi_hash(m->aspect[5], m->material + i, offsetof(cloth_material, plane) +
                                                                  sizeof(cloth_plane));
    m->hash = clothi_hash(CLOTH_VERSION_NUM, m->aspect, sizeof m->aspect);
}

CLOTH_API void cloth_model_destroy(cloth_model *model) {
    cloth_hooks hooks;
    if (!model) return;
    hooks = model->hooks;
    cloth_pattern_destroy(model->pattern);
    cloth_topology_destroy(&hooks, model->topology);
    (void)clothi_blocks(&hooks, model->block, (size_t)model->nblock);
    clothi_free(&hooks, model);
}

CLOTH_API void cloth_desc_set_mesh(cloth_desc *desc, const cloth_mesh *mesh) {
    if (!desc || !mesh) return;
    desc->nv = mesh->nv, desc->x_rest = mesh->x, desc->nf = mesh->nf, desc->faces = mesh->faces;
    desc->X = mesh->X, desc->part = mesh->part;
}

/* What is allowed and seldom meant. */
static void clothi_model_warn(const cloth_model *m, const cloth_desc *d) {
    const char *what[3] = {NULL, NULL, NULL};
    double      area = 0;
    int         i;
    for (i = 0; i < m->nf; i++) area += clothi_rest_area(m->X, i);
    if (area > 400 || area < 1e-4) what[0] = "the cloth has %g m^2: is its unit the metre?";
    if (m->topology->nh == 0 && m->nf > 1)
        what[1] = "no two of the faces share an edge: are their vertices welded?";
    if (!d->wind_on && (d->wind[0] != 0 || d->wind[1] != 0 || d->wind[2] != 0))
        what[2] = "desc.wind is set and desc.wind_on is not: no wind blows";
    for (i = 0; i < 3; i++)
        if (what[i]) clothi_say(&d->hooks, CLOTH_LOG_WARNING, CLOTH_OK, what[i], area);
}

CLOTH_API cloth_status cloth_model_create(const cloth_desc *desc, cloth_model **out) {
    cloth_model *m;
    cloth_status status;
    if (out) *out = NULL;
    if (!desc) return CLOTH_ERR_ARGUMENT;
    if (desc->cookie != CLOTHI_COOKIE) return out ? CLOTH_ERR_UNINIT : CLOTH_ERR_ARGUMENT;
    if (!out) return clothi_null(&desc->hooks, "cloth_model_create: out");
    status = clothi_check_desc(desc);
    if (status) return status;
    m = (cloth_model *)clothi_alloc(&desc->hooks, 1, sizeof *m);
    if (!m) return CLOTH_ERR_MEMORY;
    m->hooks = desc->hooks, m->desc = *desc, m->nv = desc->nv, m->nf = desc->nf;
    m->nregions = desc->nregions > 0 ? desc->nregions : 1;
    status = clothi_model_copy(m, desc);
    if (!status)
        status = clothi_check_areas(m, desc->X ? "desc.X" : "desc.x_rest", m->X,
                                    m->vertex_mass ? NULL : m->material);
    m->desc.x_rest = m->desc.X = m->desc.x = m->desc.v = m->desc.vertex_mass = NULL;
    m->desc.faces = m->desc.part = m->desc.region = NULL;
    m->desc.materials = NULL, m->desc.pins = NULL, m->desc.ties = NULL;
    if (!status) status = clothi_model_ties(m, desc);
    if (!status)
        status = cloth_topology_create(&m->hooks, m->nv, m->nf, m->faces, &m->topology);
    if (!status) status = clothi_model_elements(m);
    if (status) {
        cloth_model_destroy(m);
        return status;
    }
    clothi_model_warn(m, desc);
    clothi_model_hash(m);
    *out = m;
    return CLOTH_OK;
}

/* ===== [8.2] SIM =============================================================================
 *
 *   model (constant, shared)        sim (one per thread)
 *   topology, stencils, pattern --> state x v t, history, pins, attachments, forces, params
 *                                   derived: rest arrays of the batches      (from params)
 *                                   scratch: force buffer, matrix, vectors   (never an influence)
 *
 * The bits of a step are a function of model, params, state and inputs. What survives a step
 * and has influence is listed once, in clothi_fields; all else is scratch.
 * checked: tests/test_step.c, tests/test_determinism.c, tests/test_memory.c, tests/test_record.c
 */

#define CLOTHI_MAX_TERMS 24

typedef struct clothi_work {                /* vectors of a step, scratch                      */
    double *x0, *v0;                        /* as before the step, in `kept`                   */
    double *x, *dx, *grad;                  /* [nv x 3]                                        */
    double *y;                              /* [nv x 3], where there are pins their goals      */
    double *trial;                          /* [nv x 3] behind own.energy_batch                */
    double *free;                           /* [nv x 3] gradient without that of contact       */
    double *inv_mass;                       /* [nv] 1/kg, LEAPFROG, then two sums of [nv]      */
    double *rhs;                            /* right-hand side of the Newton system            */
    double *partial;                        /* partial sums of the parallel loops              */
    double *room;                           /* of own.force and what is behind it, LEAPFROG    */
} clothi_work;

typedef struct clothi_elements {            /* derived from params: what the lanes read        */
    double *rest;                           /* [nbatch x nrest x 8]                            */
    double *start;                          /* [nbatch x (nmeasure + 1) x 8] measure at x_n,
                                               then damping s                                  */
    double  loss;                           /* J, of the last value                            */
    const clothi_group *group;
    const clothi_kind  *kind;
    struct clothi_own  *own;                /* whose they are                                  */
} clothi_elements;

typedef struct clothi_own {                 /* all that the built-in terms have besides what a
                                               cloth_eval shows: they do not know the sim      */
    const cloth_hooks *hooks;
    clothi_elements    membrane, bend;
    double  tau;                            /* s, largest damping of a region; 0: none damped  */
    double *side;                           /* [membrane batches x 9 x 8] of [6.5], or NULL    */
    double *force;                          /* element forces, model->force_size; with a solver
                                               in its block, else in w.room: no solve goes on
                                               while elements are evaluated                    */
    double *energy_batch;                   /* [most batches x 8] elastic energy, behind them  */
    double *loss_batch;                     /* [most batches x 8] dissipation potential        */
    double *wind;                           /* [nf x 5] lagged drag direction and coefficients */
    int     force_only;                     /* energies are not wanted                         */
    int     walls;                          /* Hessians are to have those of hinges [6.3]      */
    const double *was;                      /* [nv x 3] see 'Which stress' [9.2]; NULL: x      */
    cloth_counts counts;
} clothi_own;

struct cloth_sim {
    const cloth_model *model;
    cloth_hooks  hooks;                     /* the model's; allocations are counted            */
    cloth_state  state;
    cloth_params params;                    /* accepted: what steps read                       */
    cloth_params edit;                      /* the host's copy; its pointers NULL until asked  */
    int          edit_stays;                /* what derives from params leaves it alone        */
    /* history of BDF2 */
    double *x_prev, *v_prev;
    double  h_prev;                         /* s; LEAPFROG: its last substep, without history */
    int     history;
    double  still;                          /* s, at rest; as long as desc.sleep: asleep       */
    double *still_x;                        /* [nv x 3] m, since when it is at rest            */
    /* inputs */
    cloth_step_input in;                    /* what the substep under way reads                */
    unsigned char *pin;                     /* [nv] axes                                       */
    double        *target;                  /* [nv x 3] m                                      */
    cloth_step_attachment *attach;          /* [max_attachments]                               */
    uint32_t      *made;                    /* [max_attachments] in which generation           */
    int            nattach;                 /* in use                                          */
    uint32_t       generation;              /* attachments ever made: no handle comes twice    */
    double        *force;                   /* [nv x 3] N                                      */
    int            force_on;
    double         gravity[3];
    int            wind_on;
    double         wind[3];
    /* derived */
    clothi_own own;
    double *quadratic;                      /* bending Hessian of QUADRATIC, made once         */
    int     quadratic_ready;
    int     fresh;                          /* w.grad and the terms' energies are of w.x       */
    cloth_ledger ledger;                    /* energies of the last step's result, which w.x   */
    int     known;                          /* still holds; known: if it is the state yet      */
    int     asleep, calm;                   /* the step under way moves t alone; is taken again,
                                               see clothi_booked()                             */
    double  hosted;                         /* J, that hosts' terms gain as they are in it     */
    double  frame[3];                       /* m/s, see clothi_watch_from()                    */
    double  pushed[2][3];                   /* N s, in it: of all forces, of contact's         */
    cloth_report report;                    /* of the step that runs                           */
    cloth_report rested;                    /* of a step asleep; its outcome NONE: not known   */
    double  omega_rest;                     /* rad/s at rest, LEAPFROG; 0: not known yet       */
    double  omega_bend;                     /* its square's bound of hinges; 0: they are soft  */
    double  edge;                           /* m, of the equilateral triangle of mean area     */
    double  total;                          /* kg                                              */
    /* terms */
    cloth_term    term[CLOTHI_MAX_TERMS];
    double        term_energy[CLOTHI_MAX_TERMS];
    int           nterms, nbuiltin;
    unsigned char *kept;                    /* the fields and hosts' terms as before the step  */
    cloth_recorder    recorder, host;       /* a tape's, which tells the host's; else host: 0  */
    void            (*tape_gone)(void *user);   /* the sim is destroyed; NULL: no tape         */
    size_t        recorded;                 /* bytes of `kept`                                 */
    unsigned char *touching;                /* contacts of the record                          */
    cloth_contact contact;
    int           contact_on;
    double        contact_energy;           /* J, in the last value of the objective           */
    double       *landing;                  /* [2 x nv x 3] LEAPFROG, of a tape: x, v that contact
                                               is given in this substep; NULL: not wanted      */
    double        fraction;                 /* of the way to targets that the next step goes, 1
                                               but in cloth_collide_step()                     */
    double        taken;                    /* the same of the last step                       */
    int           finish;                   /* the host's time is up                           */
    int           balance;                  /* a report is wanted: keep the ledger             */
    /* solver */
    cloth_matrix *matrix;
    cloth_linear_solver *solver;
    cloth_linear_report linear;             /* of the last solve                               */
    unsigned char *fixed;                   /* [nv] axes that the solver must not move         */
    clothi_work   w;
    cloth_times   ms;                       /* of the step that runs; clothi_charge()          */
    double       *charged, since;
    long long     allocations;
};

/* The built-in terms, in the order of the list. */
enum { CLOTHI_TERM_MEMBRANE, CLOTHI_TERM_BEND, CLOTHI_TERM_GRAVITY, CLOTHI_TERM_FORCE,
       CLOTHI_TERM_ATTACH, CLOTHI_TERM_WIND, CLOTHI_TERM_HOST };

/* --- the list of all that the next step depends on: walked by hash, save, restore, roll-back, the
 * record of a step and the count of bytes. What is not in it, nor a state of hosts' terms or of
 * contact, is scratch or derived, and may not change a bit --- */

enum {                                      /* elements of a field: clothi_field_count()       */
    CLOTHI_ONE, CLOTHI_VERTEX, CLOTHI_HINGES, CLOTHI_FACE, CLOTHI_REGION, CLOTHI_SLOT
};

enum {
    CLOTHI_ARRAY = 1,                       /* by pointer; NULL counts as zeros                */
    CLOTHI_PARAM = 2,                       /* steps only read it: no part of their record     */
    CLOTHI_HANDLE = 4,                      /* tells handles apart, not motions: not hashed    */
    CLOTHI_REAL = 8,                        /* doubles that are finite in any state            */
    CLOTHI_LATE = 16,                       /* there only after its first use                  */
    CLOTHI_LAG = 32,                        /* not of LEAPFROG                                 */
    CLOTHI_LAG2 = 64,                       /* of BDF2 alone                                   */
    CLOTHI_SLEEP = 128,                     /* of sims that may sleep                          */
    CLOTHI_INPUT = 256                      /* what the host says between steps; no step moves it */
};

typedef struct clothi_field {
    const char  *name;
    size_t       at;                        /* bytes into the sim                              */
    size_t       within, size, stride;      /* an element's bytes, in one of an array          */
    int          count, flags;
} clothi_field;

#define CLOTHI_OF(name) #name, offsetof(cloth_sim, name)
#define CLOTHI_SCALAR(name, type, n, flags)                                                      \
    {CLOTHI_OF(name), 0, (n) * sizeof(type), (n) * sizeof(type), CLOTHI_ONE, flags}
#define CLOTHI_LIST(name, type, n, count, flags)                                                 \
    {CLOTHI_OF(name), 0, (n) * sizeof(type), (n) * sizeof(type), count, CLOTHI_ARRAY | (flags)}

static const clothi_field clothi_fields[] = {           /* x and v first: see clothi_keep()    */
    CLOTHI_LIST(state.x, double, 3, CLOTHI_VERTEX, 0),
    CLOTHI_LIST(state.v, double, 3, CLOTHI_VERTEX, 0),
    CLOTHI_SCALAR(state.t, double, 1, 0),
    CLOTHI_SCALAR(history, int, 1, 0),
    CLOTHI_SCALAR(h_prev, double, 1, CLOTHI_REAL),
    CLOTHI_LIST(v_prev, double, 3, CLOTHI_VERTEX, CLOTHI_REAL | CLOTHI_LATE | CLOTHI_LAG),
    CLOTHI_LIST(x_prev, double, 3, CLOTHI_VERTEX, CLOTHI_REAL | CLOTHI_LATE | CLOTHI_LAG2),
    CLOTHI_SCALAR(still, double, 1, CLOTHI_REAL | CLOTHI_SLEEP),
    CLOTHI_LIST(still_x, double, 3, CLOTHI_VERTEX, CLOTHI_REAL | CLOTHI_LATE | CLOTHI_SLEEP),
    CLOTHI_LIST(pin, unsigned char, 1, CLOTHI_VERTEX, CLOTHI_INPUT),
    CLOTHI_LIST(target, double, 3, CLOTHI_VERTEX, CLOTHI_INPUT),
    CLOTHI_LIST(attach, cloth_step_attachment, 1, CLOTHI_SLOT, CLOTHI_INPUT),
    CLOTHI_LIST(made, uint32_t, 1, CLOTHI_SLOT, CLOTHI_HANDLE | CLOTHI_INPUT),
    CLOTHI_SCALAR(nattach, int, 1, CLOTHI_INPUT),
    CLOTHI_SCALAR(force_on, int, 1, CLOTHI_INPUT),
    CLOTHI_LIST(force, double, 3, CLOTHI_VERTEX, CLOTHI_REAL | CLOTHI_LATE | CLOTHI_INPUT),
    CLOTHI_SCALAR(gravity, double, 3, CLOTHI_REAL | CLOTHI_INPUT),
    CLOTHI_SCALAR(wind_on, int, 1, CLOTHI_INPUT),
    CLOTHI_SCALAR(wind, double, 3, CLOTHI_REAL | CLOTHI_INPUT),
    CLOTHI_SCALAR(fraction, double, 1, CLOTHI_REAL | CLOTHI_INPUT),
    {CLOTHI_OF(params.material), 0, 7 * sizeof(double), sizeof(cloth_material), CLOTHI_REGION,
     CLOTHI_ARRAY | CLOTHI_PARAM},          /* without the padding behind the plane            */
    {CLOTHI_OF(params.material), offsetof(cloth_material, plane), sizeof(cloth_plane),
     sizeof(cloth_material), CLOTHI_REGION, CLOTHI_ARRAY | CLOTHI_PARAM},
    CLOTHI_LIST(params.hinge_scale, double, 1, CLOTHI_HINGES, CLOTHI_PARAM),
    CLOTHI_LIST(params.theta0, double, 1, CLOTHI_HINGES, CLOTHI_PARAM),
    CLOTHI_LIST(params.X, double, 6, CLOTHI_FACE, CLOTHI_PARAM),
    CLOTHI_LIST(params.mass, double, 1, CLOTHI_VERTEX, CLOTHI_PARAM),
    CLOTHI_SCALAR(params.mass_given, int, 1, CLOTHI_PARAM)
};

#define CLOTHI_FIELDS (sizeof clothi_fields / sizeof *clothi_fields)

enum { CLOTHI_SIZE, CLOTHI_HASH, CLOTHI_SAVE, CLOTHI_LOAD, CLOTHI_CLEAR };

typedef struct clothi_walk {
    int            verb, skip;              /* skip: flags of fields to leave out              */
    int            lost;                    /* no memory for a unit's hash                     */
    unsigned char *buf;                     /* written to, or read from                        */
    size_t         at;                      /* in it; every field begins at a multiple of 8    */
    uint64_t       hash;
} clothi_walk;

static size_t clothi_field_count(const cloth_sim *s, const clothi_field *f) {
    const cloth_model     *m = s->model;
    const cloth_integrator by = m->desc.integrator;
    const int n[] = {1, m->nv, m->bend.count ? m->topology->nh : 0, m->nf, m->nregions,
                     m->desc.max_attachments};
    if ((f->flags & CLOTHI_LAG && by == CLOTH_INTEGRATOR_LEAPFROG) ||
        (f->flags & CLOTHI_LAG2 && by != CLOTH_INTEGRATOR_BDF2) ||
        (f->flags & CLOTHI_SLEEP && !(m->desc.sleep > 0)))
        return 0;
    return (size_t)n[f->count];
}

/* Where the field begins; NULL: an array that is not there yet. */
static unsigned char *clothi_field_data(const cloth_sim *s, const clothi_field *f) {
    void *at = (unsigned char *)(uintptr_t)s + f->at;
    if (f->flags & CLOTHI_ARRAY) memcpy(&at, at, sizeof at);
    return (unsigned char *)at;
}

CLOTHI_OUTLINE static void clothi_walk_bytes(clothi_walk *w, unsigned char *data, size_t size) {
    if (w->verb == CLOTHI_HASH) w->hash = clothi_hash(w->hash, data, size);
    else if (w->verb == CLOTHI_SAVE && data) memcpy(w->buf + w->at, data, size);
    else if (w->verb == CLOTHI_SAVE) memset(w->buf + w->at, 0, size);
    else if (w->verb == CLOTHI_LOAD && data) memcpy(data, w->buf + w->at, size);
    else if (w->verb == CLOTHI_CLEAR && data) memset(data, 0, size);
    w->at += size;
}

#define CLOTHI_PAD8(at) ((8u - (at) % 8u) % 8u)

static void clothi_walk_pad(clothi_walk *w) {
    if (w->verb == CLOTHI_SAVE) memset(w->buf + w->at, 0, CLOTHI_PAD8(w->at));
    w->at += CLOTHI_PAD8(w->at);
}

static void clothi_walk_field(const cloth_sim *s, const clothi_field *q, clothi_walk *w) {
    const size_t   n = clothi_field_count(s, q);
    unsigned char *data = clothi_field_data(s, q);
    size_t         i;
    if (n == 0) return;
    if (q->size == q->stride) clothi_walk_bytes(w, data, n * q->size);
    else for (i = 0; i < n; i++)
        clothi_walk_bytes(w, data + q->within + i * q->stride, q->size);
    clothi_walk_pad(w);
}

static void clothi_walk_fields(const cloth_sim *s, clothi_walk *w) {
    const clothi_field *q = clothi_fields;
    for (; q < clothi_fields + CLOTHI_FIELDS; q++)
        if (!(q->flags & w->skip || (q->flags & CLOTHI_HANDLE && w->verb == CLOTHI_HASH)))
            clothi_walk_field(s, q, w);
}

/* --- units: what hosts' terms and the contact keep of their own --- */

/* Unit i of a sim, in the order of the list; contact, last, as a term. 0 when there is none. */
static int clothi_unit_at(const cloth_sim *s, int i, cloth_term *u) {
    const cloth_contact *c = &s->contact;
    const cloth_term     contact = {"contact", c->user, NULL, NULL, NULL, c->save_size, c->save,
                                    c->load, 0};
    i += s->nbuiltin;
    *u = i < s->nterms ? s->term[i] : contact;
    return i < s->nterms + s->contact_on;
}

static uint64_t clothi_unit_id(const cloth_term *u) {
    return clothi_hash(0xcbf29ce484222325u, u->name, u->name ? strlen(u->name) : 0);
}

static size_t clothi_unit_size(const cloth_term *u) {
    return u->save_size && u->save && u->load ? u->save_size(u->user) : 0;
}

/* The first n of them: id, bytes, then the unit's own: it may hold more or fewer than it did at the
 * snapshot. */
static void clothi_walk_units(const cloth_sim *s, clothi_walk *w, int n) {
    const cloth_hooks *hooks = &s->model->hooks;
    unsigned char     *own;
    cloth_term         u;
    uint64_t           head[2];
    int                i;
    for (i = 0; i < n && clothi_unit_at(s, i, &u); i++, w->at += (size_t)head[1]) {
        clothi_walk_pad(w);
        head[0] = clothi_unit_id(&u), head[1] = clothi_unit_size(&u);
        clothi_walk_bytes(w, (unsigned char *)head, sizeof head);   /* loading: as was saved */
        if (head[1] && w->verb == CLOTHI_SAVE) u.save(u.user, w->buf + w->at);
        if (head[1] && w->verb == CLOTHI_LOAD) u.load(u.user, w->buf + w->at);
        if (!head[1] || w->verb != CLOTHI_HASH) continue;
        own = (unsigned char *)clothi_alloc(hooks, (size_t)head[1], 1);
        if (own) u.save(u.user, own);
        if (own) w->hash = clothi_hash(w->hash, own, (size_t)head[1]);
        w->lost |= !own;
        clothi_free(hooks, own);
    }
}

/* A walk over fields and the first `units` units; returns their bytes. */
static size_t clothi_walked(const cloth_sim *s, int verb, const void *buf, int skip, int units) {
    clothi_walk w;
    memset(&w, 0, sizeof w);
    w.verb = verb, w.skip = skip, w.buf = (unsigned char *)(uintptr_t)buf;
    clothi_walk_fields(s, &w);
    clothi_walk_units(s, &w, units);
    return w.at;
}

/* --- counted allocation --- */

static void *clothi_counted_alloc(size_t size, void *user) {
    cloth_sim         *s = (cloth_sim *)user;
    const cloth_hooks *base = &s->model->hooks;
    void *ptr = base->allocator.alloc ? base->allocator.alloc(size, base->allocator.user)
                                      : CLOTH_MALLOC(size);
    s->allocations += ptr != NULL;
    return ptr;
}

static void clothi_counted_free(void *ptr, size_t size, void *user) {
    const cloth_hooks *base = &((const cloth_sim *)user)->model->hooks;
    if (base->allocator.free) base->allocator.free(ptr, size, base->allocator.user);
    else CLOTH_FREE(ptr);
}

/* Allocates n doubles into *out unless it is there already. */
CLOTHI_OUTLINE static cloth_status clothi_need(cloth_sim *s, double **out, size_t n) {
    if (*out) return CLOTH_OK;
    *out = (double *)clothi_alloc(&s->hooks, n, sizeof(double));
    return *out ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

/* Makes the arrays that are not there yet, but for those of `skip`. */
static cloth_status clothi_fields_need(cloth_sim *s, int skip) {
    cloth_status status = CLOTH_OK;
    size_t       f;
    for (f = 0; f < CLOTHI_FIELDS && !status; f++) {
        const clothi_field *q = clothi_fields + f;
        const size_t        n = clothi_field_count(s, q);
        void               *made;
        if (!(q->flags & CLOTHI_ARRAY) || q->flags & skip || clothi_field_data(s, q) ||
            (n == 0 && q->flags & CLOTHI_LATE))
            continue;
        made = clothi_alloc(&s->hooks, n, q->stride);
        memcpy((unsigned char *)s + q->at, &made, sizeof made);
        status = made ? CLOTH_OK : CLOTH_ERR_MEMORY;
    }
    return status;
}

static void clothi_forget(cloth_sim *s) {
    const size_t bytes = 3 * (size_t)s->model->nv * sizeof(double);
    s->history = 0;
    s->still = 0;
    if (s->x_prev) memset(s->x_prev, 0, bytes);
    if (s->v_prev) memset(s->v_prev, 0, bytes);
}

/* An input of `size` bytes; another one wakes. */
CLOTHI_OUTLINE static void clothi_set(cloth_sim *s, void *at, const void *from, size_t size) {
    if (memcmp(at, from, size) == 0) return;
    memcpy(at, from, size);
    s->still = 0;
}

/* --- params to batches --- */

/* Young's modulus of the membrane, N/m, from its Lame constants. */
static double clothi_young(const cloth_material *mat) {
    double mu, lambda;
    cloth_material_lame(mat, &mu, &lambda);
    return lambda + 2 * mu > 0 ? 4 * mu * (lambda + mu) / (lambda + 2 * mu) : 0;
}

/* Where in X [nf x 3 x 2] the corner of face f at vertex v is. */
static size_t clothi_corner(const cloth_model *m, int f, int v) {
    const int *face = m->faces + 3 * (size_t)f;
    return 6 * (size_t)f + (face[0] == v ? 0 : face[1] == v ? 2 : 4);
}

/* Squared rest length of the edge from vertex a to b as face f has it. */
static double clothi_rest_edge2(const cloth_model *m, const double *X, int f, int a, int b) {
    const double *p = X + clothi_corner(m, f, a), *q = X + clothi_corner(m, f, b);
    return (q[0] - p[0]) * (q[0] - p[0]) + (q[1] - p[1]) * (q[1] - p[1]);
}

/* Rest geometry of a hinge: mean squared edge length of its two faces, and their areas. The two
 * differ where pattern pieces of unequal edge are sewn. */
typedef struct clothi_hinge_rest {
    double e2, A1, A2, bending;
} clothi_hinge_rest;

CLOTHI_OUTLINE static clothi_hinge_rest clothi_hinge_of(const cloth_model *m, const cloth_params *p,
                                                        int h) {
    const int *v = m->topology->hinges + 4 * (size_t)h;
    const int *f = m->topology->hinge_faces + 2 * (size_t)h;
    const cloth_material *a = p->material + m->region[f[0]], *b = p->material + m->region[f[1]];
    clothi_hinge_rest     r;
    r.e2 = 0.5 * (clothi_rest_edge2(m, p->X, f[0], v[0], v[1]) +
                  clothi_rest_edge2(m, p->X, f[1], v[0], v[1]));
    r.A1 = clothi_rest_area(p->X, f[0]);
    r.A2 = clothi_rest_area(p->X, f[1]);
    r.bending = 0.5 * (cloth_material_rigidity(a) + cloth_material_rigidity(b));
    return r;
}

/* Damping of element i, s: the mean of its faces' materials. */
static double clothi_element_tau(const cloth_model *m, const cloth_params *p, int kind, int i) {
    const int *f = kind == CLOTHI_TRIANGLE ? &i : kind == CLOTHI_SPRING
                       ? m->topology->edge_faces + 2 * (size_t)i
                       : m->topology->hinge_faces + 2 * (size_t)i;
    double     tau = p->material[m->region[f[0]]].damping;
    if (kind == CLOTHI_TRIANGLE || f[1] < 0) return tau;
    return 0.5 * (tau + p->material[m->region[f[1]]].damping);
}

/* An edge's spring: k = Y (A1 + A2) / L^2 with Y the membrane stiffness, which gives Y exactly
 * on an equilateral mesh (with Poisson's ratio 1/3, whatever the material says). */
static void clothi_derive_spring(const cloth_model *m, const cloth_params *p, int e,
                                 double *rest) {
    const int *v = m->topology->edges + 2 * (size_t)e;
    const int *f = m->topology->edge_faces + 2 * (size_t)e;
    double     L2 = 0, YA = 0;
    int        k, n = f[1] < 0 ? 1 : 2;
    for (k = 0; k < n; k++) {
        L2 += clothi_rest_edge2(m, p->X, f[k], v[0], v[1]);
        YA += clothi_young(p->material + m->region[f[k]]) * clothi_rest_area(p->X, f[k]);
    }
    rest[0] = YA / (L2 / n);
    rest[1] = sqrt(L2 / n);
}

/* Face k's share of the flat hinge h: q = |e|/(2 A), 1 over the height of the far corner, and t,
 * the foot of that height along the edge e; d: from its start to that corner. Returns |e|^2. */
static double clothi_quadratic_face(const cloth_model *m, const double *X, int h, int k, double *e,
                                    double *d, double *q, double *t) {
    const int    *v = m->topology->hinges + 4 * (size_t)h;
    const int     f = m->topology->hinge_faces[2 * (size_t)h + (size_t)k];
    const double *pa = X + clothi_corner(m, f, v[0]), *pb = X + clothi_corner(m, f, v[1]);
    const double *pc = X + clothi_corner(m, f, v[2 + k]);
    double        e2;
    int           i;
    for (i = 0; i < 2; i++) e[i] = pb[i] - pa[i], d[i] = pc[i] - pa[i];
    e2 = e[0] * e[0] + e[1] * e[1];
    *q = sqrt(e2) / (2 * clothi_rest_area(X, f));
    *t = (e[0] * d[0] + e[1] * d[1]) / e2;
    return e2;
}

/* Of QUADRATIC also the weights [4] 1/m: what [6.4] makes of a flat stencil, each face in its own
 * plane. */
static void clothi_derive_hinge(const cloth_model *m, const cloth_params *p, int h, double *rest) {
    const clothi_hinge_rest r = clothi_hinge_of(m, p, h);
    double                  e[2], d[2], q, t;
    int                     k;
    rest[0] = p->hinge_scale[h] * cloth_hinge_coefficient(r.bending, r.e2, r.A1, r.A2);
    rest[1] = m->bend.kind == CLOTHI_QUADRATIC ? 0 : remainder(p->theta0[h], 2 * CLOTHI_PI);
    rest[2] = 0;
    for (k = 0; k < 2 && m->bend.kind == CLOTHI_QUADRATIC; k++) {
        (void)clothi_quadratic_face(m, p->X, h, k, e, d, &q, &t);
        clothi_quadratic_wing(q, t, k, rest + 1);
    }
}

/* Fills the rest arrays of one group; a lane without an element gets zero stiffness. */
static void clothi_derive_group(const cloth_sim *s, clothi_elements *el) {
    const cloth_model  *m = s->model;
    const cloth_params *p = &s->params;
    const clothi_group *g = el->group;
    double              rest[7];
    int                 i, k;
    for (i = 0; i < g->nbatch * CLOTHI_LANES; i++) {
        const int stiff = g->kind == CLOTHI_TRIANGLE ? 5 : 0;
        int       id, back = i;
        while ((id = g->id[back]) < 0) back--;
        if (g->kind == CLOTHI_TRIANGLE) {
            rest[4] = clothi_rest_inverse(p->X + 6 * (size_t)id, rest);
            cloth_material_lame(p->material + m->region[id], rest + 5, rest + 6);
        } else if (g->kind == CLOTHI_SPRING)
            clothi_derive_spring(m, p, id, rest);
        else clothi_derive_hinge(m, p, id, rest);
        if (back < i) rest[stiff] = rest[stiff ? 6 : 0] = 0;
        for (k = 0; k < el->kind->nrest; k++)
            el->rest[(i / CLOTHI_LANES * el->kind->nrest + k) * CLOTHI_LANES +
                     i % CLOTHI_LANES] = rest[k];
    }
}

/* What triangles with hinges read, of [6.5]: QUADRATIC the unit vectors across the edges, else the
 * stretch in terms of edges. */
static void clothi_derive_sides(cloth_sim *s) {
    enum { L = CLOTHI_LANES };
    int i, k;
    for (i = 0; i < s->model->membrane.nbatch * L; i++) {
        const double *B = s->own.membrane.rest + (size_t)(i / L) * 7 * L + i % L;
        const double  area = B[4 * L], mu = B[5 * L], lambda = B[6 * L];
        const double  g1 = B[0] * B[0] + B[L] * B[L], g12 = B[0] * B[2 * L] + B[L] * B[3 * L];
        const double  g2 = B[2 * L] * B[2 * L] + B[3 * L] * B[3 * L];
        const double  inv = 4 * area * area, both = area * (mu + 0.5 * lambda);
        double       *side = s->own.side + (size_t)(i / L) * 9 * L + i % L;
        if (s->model->bend.kind == CLOTHI_QUADRATIC) {
            const double g0 = g1 + g2 + 2 * g12;
            for (k = 0; k < 2; k++) {
                side[k * L] = -(B[k * L] + B[(k + 2) * L]) / sqrt(g0);
                side[(2 + k) * L] = B[k * L] / sqrt(g1);
                side[(4 + k) * L] = B[(k + 2) * L] / sqrt(g2);
            }
            continue;
        }
        side[0] = g2 * inv;
        side[L] = g1 * inv;
        side[2 * L] = -g12 * inv;
        side[3 * L] = both * g1 * g1;
        side[4 * L] = area * (mu * g12 * g12 + 0.5 * lambda * g1 * g2);
        side[5 * L] = both * g2 * g2;
        side[6 * L] = both * g1 * g12;
        side[7 * L] = both * g2 * g12;
        side[8 * L] = area * (mu * (g1 * g2 + g12 * g12) + lambda * g12 * g12);
    }
}

/* Lumped masses: a third of each triangle's to each corner. */
static void clothi_derive_mass(cloth_sim *s) {
    const cloth_model *m = s->model;
    const int lumped = !s->params.mass_given;
    double   *mass = s->params.mass;
    int       f, k, i;
    if (lumped) memset(mass, 0, (size_t)m->nv * sizeof *mass);
    for (f = 0; lumped && f < m->nf; f++) {
        double third = s->params.material[m->region[f]].density *
                       clothi_rest_area(s->params.X, f) / 3;
        for (k = 0; k < 3; k++) mass[m->faces[3 * f + k]] += third;
    }
    for (i = 0, s->total = 0; i < m->nv; i++) {
        if (lumped && !(mass[i] > 0)) mass[i] = mass[m->faces[0]];  /* of no triangle */
        s->total += mass[i];
    }
}

/* Everything that a host may have written, p in place of the accepted params. */
static cloth_status clothi_check_params(const cloth_sim *s, const cloth_params *p) {
    const cloth_model  *m = s->model;
    const cloth_hooks  *hooks = &s->hooks;
    cloth_status        status = CLOTH_OK;
    int                 i, nh = s->params.nh;
    for (i = 0; i < m->nregions && !status; i++)
        status = cloth_material_check(hooks, p->material + i, i);
    if (status) return status;
    status = clothi_check_each(hooks, "params.hinge_scale", p->hinge_scale, nh, 0, 0);
    if (!status) status = clothi_check_vector(hooks, "params.theta0", p->theta0, nh);
    for (i = 0; i < nh && m->bend.kind == CLOTHI_QUADRATIC && !status; i++)
        if (fabs(p->theta0[i]) > 1e-9)
            status = clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED,
                                 "params.theta0[%i] = %g: CLOTH_BEND_QUADRATIC is flat at rest", i,
                                 p->theta0[i]);
    if (!status) status = clothi_check_vector(hooks, "params.X", p->X, 6 * m->nf);
    if (!status)
        status = clothi_check_areas(m, "params.X", p->X, p->mass_given ? NULL : p->material);
    if (status || !p->mass_given) return status;
    return clothi_check_each(hooks, "params.mass", p->mass, m->nv, 0, 1);
}

/* Values of `from` into the arrays of `to`, of which those that are not there yet are made. */
static cloth_status clothi_params_copy(cloth_sim *s, const cloth_params *from, cloth_params *to) {
    size_t f;
    for (f = 0; f < CLOTHI_FIELDS; f++) {
        const clothi_field *q = clothi_fields + f;
        const size_t        n = clothi_field_count(s, q), at = q->at - offsetof(cloth_sim, params);
        void               *a, *b;
        if (!(q->flags & CLOTHI_ARRAY && q->flags & CLOTHI_PARAM) || q->within) continue;
        memcpy(&a, (const unsigned char *)from + at, sizeof a);
        memcpy(&b, (unsigned char *)to + at, sizeof b);
        if (!b) b = clothi_alloc(&s->hooks, n, q->stride);
        memcpy((unsigned char *)to + at, &b, sizeof b);
        if (!b) return CLOTH_ERR_MEMORY;
        memcpy(b, a, n * q->stride);
    }
    to->nregions = s->params.nregions, to->nh = s->params.nh, to->nf = s->params.nf;
    to->nv = s->params.nv, to->mass_given = from->mass_given != 0;
    return CLOTH_OK;
}

/* All that follows from params, and the host's copy of them. */
static void clothi_derive(cloth_sim *s) {
    double area = 0;
    int    i;
    for (i = 0; i < s->model->nf; i++) area += clothi_rest_area(s->params.X, i);
    s->edge = sqrt(4 / sqrt(3.0) * area / s->model->nf);
    clothi_derive_mass(s);
    for (i = 0, s->own.tau = 0; i < s->model->nregions; i++)
        s->own.tau = clothi_max(s->own.tau, s->params.material[i].damping);
    clothi_derive_group(s, &s->own.membrane);
    clothi_derive_group(s, &s->own.bend);
    if (s->own.side) clothi_derive_sides(s);
    s->quadratic_ready = s->known = 0, s->rested.outcome = CLOTH_STEP_NONE;
    s->omega_rest = 0;
    if (s->edit.mass && !s->edit_stays) (void)clothi_params_copy(s, &s->params, &s->edit);
}

CLOTH_API cloth_params *cloth_sim_params(cloth_sim *sim) {
    if (!sim) return NULL;
    if (!sim->edit.mass && clothi_params_copy(sim, &sim->params, &sim->edit)) return NULL;
    return &sim->edit;
}

CLOTH_API cloth_status cloth_sim_params_changed(cloth_sim *sim) {
    cloth_status status;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!sim->edit.mass) return CLOTH_OK;   /* nobody asked for them: nothing was written */
    status = clothi_check_params(sim, &sim->edit);
    if (status) return status;
    (void)clothi_params_copy(sim, &sim->edit, &sim->params);
    clothi_derive(sim);                     /* masses may be lumped anew */
    clothi_forget(sim);
    return CLOTH_OK;
}

/* --- create --- */

/* State, inputs and params as the model has them. */
static void clothi_sim_start(cloth_sim *s) {
    const cloth_model *m = s->model;
    cloth_params      *p = &s->params;
    size_t nv = (size_t)m->nv;
    int    i;
    (void)clothi_walked(s, CLOTHI_CLEAR, NULL, CLOTHI_PARAM | CLOTHI_HANDLE, 0);
    memcpy(s->state.x, m->x, 3 * nv * sizeof(double));
    if (m->v) memcpy(s->state.v, m->v, 3 * nv * sizeof(double));
    memcpy(s->pin, m->pin, nv);
    memcpy(s->target, m->x, 3 * nv * sizeof(double));
    memcpy(s->gravity, m->desc.gravity, sizeof s->gravity);
    memcpy(s->wind, m->desc.wind, sizeof s->wind);
    s->wind_on = m->desc.wind_on != 0, s->fraction = 1;
    p->nregions = m->nregions, p->nf = m->nf, p->nv = m->nv;
    p->nh = m->bend.count ? m->topology->nh : 0;
    memcpy(p->material, m->material, (size_t)m->nregions * sizeof(cloth_material));
    memcpy(p->X, m->X, 6 * (size_t)m->nf * sizeof(double));
    for (i = 0; i < p->nh; i++) p->hinge_scale[i] = 1, p->theta0[i] = m->theta0[i];
    p->mass_given = m->vertex_mass != NULL;
    if (m->vertex_mass) memcpy(p->mass, m->vertex_mass, nv * sizeof(double));
    clothi_derive(s);
}

static void clothi_terms_install(cloth_sim *s);          /* [9.1] */

CLOTH_API cloth_status cloth_sim_create(const cloth_model *model, cloth_sim **out) {
    cloth_sim   *s;
    cloth_status status;
    int          i;
    if (!out) return clothi_null(model ? &model->hooks : NULL, "cloth_sim_create: out");
    *out = NULL;
    if (!model) return CLOTH_ERR_ARGUMENT;
    s = (cloth_sim *)clothi_alloc(&model->hooks, 1, sizeof *s);
    if (!s) return CLOTH_ERR_MEMORY;
    s->model = model, s->hooks = model->hooks, s->hooks.allocator.alloc = clothi_counted_alloc;
    s->hooks.allocator.free = clothi_counted_free, s->hooks.allocator.user = s;
    s->own.hooks = &s->hooks;
    status = clothi_fields_need(s, CLOTHI_LATE);
    for (i = 0; i < 2 && !status; i++) {
        const clothi_group *g = i ? &model->bend : &model->membrane;
        clothi_elements    *el = i ? &s->own.bend : &s->own.membrane;
        el->group = g, el->own = &s->own;
        el->kind = clothi_kinds + g->kind;
        status = clothi_need(s, &el->rest, (size_t)(g->nbatch * el->kind->nrest) * CLOTHI_LANES);
    }
    if (!status && model->wing)
        status = clothi_need(s, &s->own.side, 9 * (size_t)model->membrane.nbatch * CLOTHI_LANES);
    if (!status) s->fixed = (unsigned char *)clothi_alloc(&s->hooks, (size_t)model->nv, 1);
    if (!s->fixed) {                        /* the last of them                                */
        cloth_sim_destroy(s);
        return CLOTH_ERR_MEMORY;
    }
    clothi_sim_start(s);
    clothi_terms_install(s);
    *out = s;
    return CLOTH_OK;
}

/* Bytes of what the elements are derived to and evaluated in; freed where hooks say how. */
static size_t clothi_own_blocks(const clothi_own *o, const cloth_hooks *hooks) {
    const void *const block[] = {o->membrane.rest, o->membrane.start, o->bend.rest, o->bend.start,
                                 o->side, o->loss_batch, o->wind};
    return clothi_blocks(hooks, block, sizeof block / sizeof *block);
}

static size_t clothi_work_blocks(const cloth_sim *s, const cloth_hooks *hooks) {
    const clothi_work *w = &s->w;
    const void *const  block[] = {w->x, w->dx, w->grad, w->y, w->free, w->rhs, w->inv_mass,
                                  w->partial, w->room, s->kept, s->touching, s->fixed,
                                  s->quadratic};
    return clothi_blocks(hooks, block, sizeof block / sizeof *block);
}

static size_t clothi_state_blocks(const cloth_sim *s, const cloth_hooks *hooks) {
    const cloth_params *p = &s->edit;
    const void *block[CLOTHI_FIELDS + 5] = {p->mass, p->X, p->theta0, p->hinge_scale, p->material};
    size_t      f, n = 5;
    for (f = 0; f < CLOTHI_FIELDS; f++)
        if (clothi_fields[f].flags & CLOTHI_ARRAY && clothi_fields[f].within == 0)
            block[n++] = clothi_field_data(s, clothi_fields + f);
    return clothi_blocks(hooks, block, n);
}

CLOTH_API void cloth_sim_destroy(cloth_sim *sim) {
    if (!sim) return;
    if (sim->tape_gone) sim->tape_gone(sim->recorder.user);
    if (sim->contact_on && sim->contact.orphan) sim->contact.orphan(sim->contact.user);
    cloth_linear_solver_destroy(sim->solver);
    cloth_matrix_destroy(sim->matrix);
    (void)clothi_own_blocks(&sim->own, &sim->hooks);
    (void)clothi_work_blocks(sim, &sim->hooks);
    (void)clothi_state_blocks(sim, &sim->hooks);
    clothi_free(&sim->model->hooks, sim);
}

CLOTHI_RARE_END

/* ===== [9.1] ENERGY TERMS ====================================================================
 *
 *   E_pot(x) = stretch + bend + gravity + external force + attachments + wind + host's terms
 *
 * One list; the minimiser knows no names. A term adds its value, gradient and Hessian blocks
 * and can pull a vector back through its gradient (vjp), which is all that an adjoint needs:
 *
 *   gravity       E = -sum_i m_i g.x_i                                   grad_i = -m_i g
 *   force         E = -sum_i f_i.x_i                                     grad_i = -f_i
 *   attachment    E = 1/2 k |p - target|^2,  p = sum_k b_k x_k           3 vertices
 *     a stitch    p = sum_k b_k x_k - sum_k a_k x_k of the other face     6 vertices
 *   wind          a dissipation potential, lagged: see clothi_wind_begin()
 *   damping       inside stretch and bend: (tau/h) times the elastic energy of the CHANGE of
 *                 strain (or angle) in the step. Strain does not see rigid motion, so free fall
 *                 and rotation are not slowed. What is dissipated in a step is twice its value.
 *
 * Why damping has that form. Write a triangle's energy as A/2 E:C:E. Its damping term is
 *     Ed = (tau/h) A/2 dE:C:dE,  dE = E - E^n,   so  grad Ed = A Sd:(dE/dx),  Sd = (tau/h) C:dE
 * and Sd is tau C:(rate of strain): the stress of a dashpot tau C beside the spring C (Kelvin and
 * Voigt). In the step Sd does the work A Sd:dE = (tau/h) A dE:C:dE = 2 Ed >= 0 against the motion:
 * that much is dissipated, in the ledger exactly. A rigid motion x -> R x + b turns F into R F and
 * leaves E = 1/2 (F'R'R F - I) alone: dE = 0, no force. (A drag on velocities would slow a fall.)
 * A mode omega is then damped by zeta = tau omega/2: stiff modes first.
 *
 * checked: tests/test_terms.c (differences of terms and vjps), test_step.c, test_attach.c
 */

/* --- elements: gather positions, evaluate eight, keep or scatter --- */

typedef struct clothi_pass {                /* one sweep over one group                        */
    const cloth_eval *e;
    clothi_elements  *el;
    double            inv_h;                /* 1/h for damping, 0: none                        */
    cloth_matrix     *hess;                 /* NULL: not wanted                                */
    double           *energy, *loss;        /* [nbatch x 8]                                    */
} clothi_pass;

/* Adds the lanes' Hessian blocks to the matrix: see [6.1]. A slot's lowest bit says that the matrix
 * holds the transpose. Turning lanes into blocks is a transposition of 4x4 numbers; by single
 * numbers it costs twice as much. */
#if defined(CLOTHI_AVX)
/* out[lane] = numbers r0 r1 r2 r3 of four lanes. */
CLOTHI_LANE void clothi_turn4(const double *H, int r0, int r1, int r2, int r3, __m256d *out) {
    const __m256d a = _mm256_loadu_pd(H + r0 * CLOTHI_LANES);
    const __m256d b = _mm256_loadu_pd(H + r1 * CLOTHI_LANES);
    const __m256d c = _mm256_loadu_pd(H + r2 * CLOTHI_LANES);
    const __m256d d = _mm256_loadu_pd(H + r3 * CLOTHI_LANES);
    const __m256d ab0 = _mm256_unpacklo_pd(a, b), ab1 = _mm256_unpackhi_pd(a, b);
    const __m256d cd0 = _mm256_unpacklo_pd(c, d), cd1 = _mm256_unpackhi_pd(c, d);
    out[0] = _mm256_permute2f128_pd(ab0, cd0, 0x20);
    out[1] = _mm256_permute2f128_pd(ab1, cd1, 0x20);
    out[2] = _mm256_permute2f128_pd(ab0, cd0, 0x31);
    out[3] = _mm256_permute2f128_pd(ab1, cd1, 0x31);
}

static void clothi_scatter_pair(cloth_matrix *to, const int *slot, const int *id,
                                const double *H) {
    int half, k;
    for (half = 0; half < CLOTHI_LANES; half += 4) {
        __m256d head[2][4], tail[2][4];     /* as it is, and transposed */
        clothi_turn4(H + half, 0, 1, 2, 3, head[0]);
        clothi_turn4(H + half, 4, 5, 6, 7, tail[0]);
        clothi_turn4(H + half, 0, 3, 6, 1, head[1]);
        clothi_turn4(H + half, 4, 7, 2, 5, tail[1]);
        for (k = 0; k < 4; k++) {
            int     at = slot[half + k];
            double *A = clothi_matrix_block(to, at);
            if (id[half + k] < 0) continue;
            _mm256_storeu_pd(A, _mm256_add_pd(_mm256_loadu_pd(A), head[at & 1][k]));
            _mm256_storeu_pd(A + 4, _mm256_add_pd(_mm256_loadu_pd(A + 4), tail[at & 1][k]));
            A[8] += H[8 * CLOTHI_LANES + half + k];
        }
    }
}
#else
static void clothi_scatter_pair(cloth_matrix *to, const int *slot, const int *id,
                                const double *H) {
    enum { L = CLOTHI_LANES };
    int lane;
    for (lane = 0; lane < L; lane++, H++) {
        double *A = clothi_matrix_block(to, slot[lane]);
        if (id[lane] < 0) continue;
        if (slot[lane] & 1)
            A[0] += H[0], A[1] += H[3 * L], A[2] += H[6 * L], A[3] += H[L], A[4] += H[4 * L],
            A[5] += H[7 * L], A[6] += H[2 * L], A[7] += H[5 * L], A[8] += H[8 * L];
        else
            A[0] += H[0], A[1] += H[L], A[2] += H[2 * L], A[3] += H[3 * L], A[4] += H[4 * L],
            A[5] += H[5 * L], A[6] += H[6 * L], A[7] += H[7 * L], A[8] += H[8 * L];
    }
}
#endif

static void clothi_scatter(const clothi_group *g, cloth_matrix *to, int b, const double *H) {
    int k, pairs = clothi_group_pairs(g);
    for (k = 0; k < pairs; k++)
        clothi_scatter_pair(to, g->slot + (size_t)(b * pairs + k) * CLOTHI_LANES,
                            g->id + (size_t)b * CLOTHI_LANES, H + (size_t)k * 9 * CLOTHI_LANES);
}

/* Positions of the corners of batch b. */
static void clothi_corners(const clothi_group *g, const double *x, int b, double *out) {
    clothi_gather_lanes(x, g->vert + (size_t)b * (size_t)g->width * CLOTHI_LANES, g->width, out);
}

/* Of batch b: its numbers at rest, at the start of the substep, and damp [8]. */
static void clothi_batch_rest(const clothi_elements *el, int b, double inv_h, const double **rest,
                              const double **start, double *damp) {
    const int    on = el->own->tau > 0 && inv_h > 0;
    const size_t n = (size_t)el->kind->nmeasure * CLOTHI_LANES;
    int          k;
    *rest = el->rest + (size_t)b * (size_t)el->kind->nrest * CLOTHI_LANES;
    *start = on ? el->start + (size_t)b * (n + CLOTHI_LANES) : clothi_none;
    for (k = 0; k < CLOTHI_LANES; k++) damp[k] = on ? (*start)[n + (size_t)k] * inv_h : 0.0;
}

/* Batch b of a group: energy, element forces and Hessian as asked. */
static void clothi_batch(const clothi_pass *p, int b) {
    const clothi_elements *el = p->el;
    const clothi_group    *g = el->group;
    const double          *rest, *start;
    double x[12 * CLOTHI_LANES], damp[CLOTHI_LANES], H[54 * CLOTHI_LANES], unused[2 * CLOTHI_LANES];
    double f[12 * CLOTHI_LANES], was[12 * CLOTHI_LANES], *to = f;
    clothi_corners(g, p->e->x, b, x);
    clothi_batch_rest(el, b, p->inv_h, &rest, &start, damp);
    if (p->e->grad)
        to = el->own->force + g->force + (size_t)b * (size_t)g->width * 3 * CLOTHI_LANES;
    if (p->e->grad && !p->energy && start == clothi_none && g->kind == CLOTHI_TRIANGLE)
        clothi_stretch_forces(x, rest, to);
    else if (p->energy || p->e->grad)
        el->kind->lanes(x, rest, start, damp,
                        p->energy ? p->energy + (size_t)b * CLOTHI_LANES : unused,
                        p->energy && start != clothi_none ? p->loss + (size_t)b * CLOTHI_LANES
                                                          : unused + CLOTHI_LANES, to);
    if (!p->hess) return;
    if (el->own->was) clothi_corners(g, el->own->was, b, was);
    el->kind->blocks(x, el->own->was ? was : x, rest, start, damp, p->e->psd, H);
    if (el->own->walls && g->kind == CLOTHI_HINGE) clothi_hinge_walls(x, rest, damp, H);
    clothi_scatter(g, p->hess, b, H);
}

static void clothi_pass_batches(int begin, int end, int worker, void *ctx) {
    int b;
    (void)worker;
    for (b = begin; b < end; b++) clothi_batch((const clothi_pass *)ctx, b);
}

static void clothi_pass_domains(int begin, int end, int worker, void *ctx) {
    const clothi_pass *p = (const clothi_pass *)ctx;
    clothi_pass_batches(p->el->group->domain[begin], p->el->group->domain[end], worker, ctx);
}

/* n a multiple of CLOTHI_LANES. */
static double clothi_lane_sum(const double *a, int n) {
    double s[CLOTHI_LANES] = {0};
    int    i, k;
    for (i = 0; i < n; i += CLOTHI_LANES)
        for (k = 0; k < CLOTHI_LANES; k++) s[k] += a[i + k];
    return ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
}

/* Measures at the start of the substep and damping, when something is damped. */
static void clothi_start_range(int begin, int end, int worker, void *ctx) {
    const clothi_pass     *p = (const clothi_pass *)ctx;
    const clothi_elements *el = p->el;
    const clothi_group    *g = el->group;
    const size_t n = (size_t)el->kind->nmeasure * CLOTHI_LANES;
    double       x[12 * CLOTHI_LANES], *start = el->start + (size_t)begin * (n + CLOTHI_LANES);
    int          b, k;
    (void)worker;
    for (b = begin; b < end; b++, start += n + CLOTHI_LANES) {
        const int *id = g->id + (size_t)b * CLOTHI_LANES;
        clothi_corners(g, p->e->x_n, b, x);
        el->kind->measure(x, el->rest + (size_t)b * (size_t)el->kind->nrest * CLOTHI_LANES, start);
        for (k = 0; k < CLOTHI_LANES; k++)
            start[n + (size_t)k] =
                id[k] < 0 ? 0 : clothi_element_tau(p->e->model, p->e->params, g->kind, id[k]);
    }
}

typedef struct clothi_vertices {            /* one sweep over vertices                         */
    const cloth_sim *s;
    double           w;                     /* 1/eta^2                                         */
    const double    *x;
    double          *grad, *partial;
} clothi_vertices;

/* grad = gathered element forces. */
static void clothi_gather_range(int begin, int end, int worker, void *ctx) {
    const clothi_vertices *q = (const clothi_vertices *)ctx;
    const cloth_model     *m = q->s->model;
    (void)worker;
    clothi_sum_corners(q->s->own.force, m->gather_start, m->gather_start + 1, m->gather, begin, end,
                       1.0, q->grad);
}

/* 1/2 w |x - y|^2_M by chunks of vertices, w = 1/eta^2: see [9.2]. */
static void clothi_inertia_range(int begin, int end, int worker, void *ctx) {
    const clothi_vertices *q = (const clothi_vertices *)ctx;
    const cloth_sim       *s = q->s;
    const double           w = q->w;
    int                   c, i, k;
    (void)worker;
    for (c = begin; c < end; c++) {
        int    last = (c + 1) * CLOTHI_VERTICES < s->model->nv ? (c + 1) * CLOTHI_VERTICES
                                                               : s->model->nv;
        double sum = 0;
        for (i = c * CLOTHI_VERTICES; w > 0 && i < last; i++)      /* else y may be anything */
            for (k = 0; k < 3; k++) {
                double m = w * s->params.mass[i], d = q->x[3 * i + k] - s->w.y[3 * i + k];
                sum += 0.5 * m * d * d;
                if (q->grad) q->grad[3 * i + k] += m * d;
            }
        q->partial[c] = sum;
    }
}

static cloth_status clothi_gravity_eval(void *user, const cloth_eval *e, double *energy) {
    const double *m = e->params->mass, *g = e->in->gravity;
    double        sum = 0;
    int           i, k;
    (void)user;
    for (i = 0; i < e->nv; i++) sum -= m[i] * clothi_dot3(g, e->x + 3 * i);
    for (i = 0; e->grad && i < e->nv; i++)
        for (k = 0; k < 3; k++) e->grad[3 * i + k] -= m[i] * g[k];
    *energy = sum;
    return CLOTH_OK;
}

CLOTHI_RARE_BEGIN

/* A sweep over a group; energies are summed in batch order whatever the workers did. */
static cloth_status clothi_elements_eval(void *user, const cloth_eval *e, double *energy) {
    clothi_elements    *el = (clothi_elements *)user;
    clothi_own         *own = el->own;
    const clothi_group *g = el->group;
    clothi_pass         p;
    *energy = el->loss = 0;
    if (g->count == 0) return CLOTH_OK;
    p.e = e, p.el = el, p.inv_h = e->h > 0 ? 1 / e->h : 0;
    p.hess = g->kind == CLOTHI_QUADRATIC && !(own->tau > 0) ? NULL : e->hess;   /* else constant */
    p.energy = own->force_only ? NULL : own->energy_batch;
    p.loss = own->loss_batch;
    if (p.hess) {                           /* domains side by side, then what they share */
        clothi_for(own->hooks, g->ndomain, 1, clothi_pass_domains, &p);
        clothi_pass_domains(g->ndomain, g->ndomain + 1, 0, &p);
        own->counts.hessians += g->count, own->counts.bend_assemblies += el == &own->bend;
    } else
        clothi_for(own->hooks, g->nbatch, CLOTHI_CHUNK, clothi_pass_batches, &p);
    *(g->kind == CLOTHI_TRIANGLE ? &own->counts.triangles : g->kind == CLOTHI_SPRING
          ? &own->counts.springs : &own->counts.hinges) += g->count;
    if (!p.energy) return CLOTH_OK;
    if (own->tau > 0 && p.inv_h > 0) el->loss = clothi_lane_sum(p.loss, g->nbatch * CLOTHI_LANES);
    *energy = clothi_lane_sum(p.energy, g->nbatch * CLOTHI_LANES) + el->loss;
    return CLOTH_OK;
}

static cloth_status clothi_elements_begin(void *user, const cloth_eval *e) {
    clothi_pass p;
    p.e = e, p.el = (clothi_elements *)user;
    if (p.el->own->tau > 0)
        clothi_for(p.el->own->hooks, p.el->group->nbatch, CLOTHI_CHUNK, clothi_start_range, &p);
    return CLOTH_OK;
}

static void clothi_gather_forces(cloth_sim *s, double *grad) {
    clothi_vertices q;
    q.s = s, q.grad = grad;
    clothi_for(&s->hooks, s->model->nv, CLOTHI_VERTICES, clothi_gather_range, &q);
}

/* --- Hessian times vector, eight elements at a time, without a matrix --- */

typedef struct clothi_hvp {                 /* one sweep                                       */
    const cloth_sim       *s;
    const clothi_elements *el;
    const cloth_eval      *e;               /* NULL: at the template                           */
    const double          *x, *u;           /* [nv x 3]                                        */
} clothi_hvp;

/* Corners x of triangles or springs to where these are at rest, in the planes and along the lines
 * in which they are: F -> Q of F = Q S, S symmetric. */
static void clothi_unstrained(int kind, const double *rest, double *x) {
    enum { L = CLOTHI_LANES };
    int k;
    for (k = 0; k < L && kind == CLOTHI_SPRING; k++) {
        const clothi_vec p = clothi_vec_at(x, 0, k), d = clothi_edge(x, 1, k);
        const double     size = sqrt(clothi_vec_dot(d, d)) + 1e-300;
        clothi_vec_put(x, 3, k, clothi_vec_plus(p, rest[L + k] / size, d));
    }
    for (k = 0; k < L && kind == CLOTHI_TRIANGLE; k++) {
        const clothi_vec p = clothi_vec_at(x, 0, k);
        const clothi_tri t = clothi_tri_at(x, rest, k);
        const clothi_vec n = clothi_vec_cross(t.F1, t.F2);
        const double     size = 1 / (sqrt(clothi_vec_dot(n, n)) + 1e-300);
        const clothi_vec q1 = clothi_vec_plus(t.F1, size, clothi_vec_cross(t.F2, n));
        const clothi_vec q2 = clothi_vec_plus(t.F2, size, clothi_vec_cross(n, t.F1));
        const double     det = (rest[k] * rest[3 * L + k] - rest[L + k] * rest[2 * L + k]) *
                           sqrt(clothi_vec_dot(q1, q1));
        if (!(fabs(det) > 0)) continue;     /* collapsed in the template */
        clothi_vec_put(x, 3, k, clothi_vec_plus(
            p, 1 / det, clothi_vec_mix(rest[3 * L + k], q1, -rest[2 * L + k], q2)));
        clothi_vec_put(x, 6, k, clothi_vec_plus(
            p, 1 / det, clothi_vec_mix(-rest[L + k], q1, rest[k], q2)));
    }
}

static void clothi_hvp_range(int begin, int end, int worker, void *ctx) {
    enum { L = CLOTHI_LANES };
    const clothi_hvp   *p = (const clothi_hvp *)ctx;
    const clothi_group *g = p->el->group;
    const double       *rest, *start, inv_h = p->e && p->e->h > 0 ? 1 / p->e->h : 0;
    double x[12 * L], x_n[12 * L], u[12 * L], damp[L], d[7 * L], dtau[L], d_x_n[12 * L];
    int    b;
    (void)worker;
    for (b = begin; b < end; b++) {
        clothi_corners(g, p->x, b, x);
        clothi_corners(g, p->u, b, u);
        clothi_batch_rest(p->el, b, inv_h, &rest, &start, damp);
        if (start != clothi_none) clothi_corners(g, p->e->x_n, b, x_n);
        if (!p->e) clothi_unstrained(g->kind, rest, x);
        p->el->kind->vjp(x, start != clothi_none ? x_n : x, u, rest, damp, d, dtau, d_x_n,
                         p->s->own.force + g->force + (size_t)b * (size_t)g->width * 3 * L);
    }
}

/* out [nv x 3] = H u of stretch and bending at x [nv x 3], the derivative of each element's force
 * along u, floors of triangles near collapse [6.3] as constants; damped from e->x_n on, where they
 * begin(). e NULL: x is the template, each element without strain.
 * checked: tests/test_grad.c: hessian_times_vector */
static void clothi_hessian_times(cloth_sim *s, const cloth_eval *e, const double *x,
                                 const double *u, double *out) {
    clothi_hvp p;
    int        i;
    p.s = s, p.e = e, p.x = x, p.u = u;
    for (i = 0; i < 2; i++) {
        p.el = i ? &s->own.bend : &s->own.membrane;
        clothi_for(&s->hooks, p.el->group->nbatch, CLOTHI_CHUNK, clothi_hvp_range, &p);
    }
    clothi_gather_forces(s, out);
}

/* --- gravity and external force --- */

static cloth_status clothi_gravity_vjp(void *user, const cloth_eval *e, const double *a,
                                       cloth_vjp *out) {
    int i, k;
    (void)user;
    for (i = 0; i < e->nv; i++) {
        if (out->mass) out->mass[i] -= clothi_dot3(a + 3 * i, e->in->gravity);
        for (k = 0; out->gravity && k < 3; k++)
            out->gravity[k] -= a[3 * i + k] * e->params->mass[i];
    }
    return CLOTH_OK;
}

static cloth_status clothi_force_eval(void *user, const cloth_eval *e, double *energy) {
    const double *f = e->in->force;
    double        sum = 0;
    int           i;
    (void)user;
    for (i = 0; f && i < 3 * e->nv; i++) sum -= f[i] * e->x[i];
    for (i = 0; f && e->grad && i < 3 * e->nv; i++) e->grad[i] -= f[i];
    *energy = sum;
    return CLOTH_OK;
}

static cloth_status clothi_force_vjp(void *user, const cloth_eval *e, const double *a,
                                     cloth_vjp *out) {
    int i;
    (void)user;
    for (i = 0; out->force && i < 3 * e->nv; i++) out->force[i] -= a[i];
    return CLOTH_OK;
}

/* --- attachments --- */

/* n, the vertices v and weights w of attachment q, and r = sum w x - goal; goal: where it pulls to
 * at the end of the substep, 0 without `in`. n = 0: not used. */
CLOTHI_OUTLINE static int clothi_attach_gap(const cloth_model *m, const cloth_step_input *in,
                                            const cloth_step_attachment *q, const double *x,
                                            int *v, double *w, double *r) {
    const int n = !q->used ? 0 : q->on < 0 ? 6 : 3;
    int       k;
    r[0] = r[1] = r[2] = 0;
    for (k = 0; k < 3 * n; k++) {
        v[k / 3] = m->faces[3 * (k < 9 ? q->face : q->other) + k / 3 % 3];
        w[k / 3] = k < 9 ? q->bary[k / 3] : -q->at[k / 3 - 3];
        r[k % 3] += w[k / 3] * x[3 * v[k / 3] + k % 3];
    }
    for (k = 0; in && k < 3; k++) r[k] -= q->pose[k] + in->share[1] * (q->target[k] - q->pose[k]);
    return n;
}

static cloth_status clothi_attach_eval(void *user, const cloth_eval *e, double *energy) {
    cloth_status status = CLOTH_OK;
    double       sum = 0, r[3], w[6], H[324];
    int          i, j, k, n, v[6];
    (void)user;
    for (i = 0; i < e->in->nattach && !status; i++) {
        const cloth_step_attachment *q = e->in->attach + i;
        n = clothi_attach_gap(e->model, e->in, q, e->x, v, w, r);
        if (n) sum += 0.5 * q->k * clothi_dot3(r, r);
        for (j = 0; e->grad && j < 3 * n; j++)
            e->grad[3 * v[j / 3] + j % 3] += q->k * w[j / 3] * r[j % 3];
        if (!e->hess || !n) continue;
        memset(H, 0, sizeof H);
        for (j = 0; j < 3 * n; j++)
            for (k = j % 3; k < 3 * n; k += 3) H[3 * n * j + k] = q->k * w[j / 3] * w[k / 3];
        status = cloth_matrix_add_element(e->hess, n, v, H);
    }
    *energy = sum;
    return status;
}

static cloth_status clothi_attach_vjp(void *user, const cloth_eval *e, const double *a,
                                      cloth_vjp *out) {
    double r[3], ap[3], w[6];
    int    i, k, v[6];
    (void)user;
    for (i = 0; i < e->in->nattach; i++) {
        const cloth_step_attachment *q = e->in->attach + i;
        if (!clothi_attach_gap(e->model, e->in, q, e->x, v, w, r)) continue;
        (void)clothi_attach_gap(e->model, NULL, q, a, v, w, ap);
        for (k = 0; out->attach && k < 3; k++)
            out->attach[3 * i + k] -= e->in->share[1] * q->k * ap[k];
        if (out->attach_k) out->attach_k[i] += clothi_dot3(ap, r);
    }
    return CLOTH_OK;
}

/* --- wind ---
 *
 *      w  velocity of the air         n  unit normal of the face at x^n
 *      u  = v_face - w at x^n, v^n    A  its area at x^n
 *
 *   drag  along the normal            c_n = 1/2 rho drag A |u|   [kg/s]
 *   lift  across it (in-plane slip)   c_t = 1/2 rho lift A |u|   [kg/s]
 *   potential  P(x) = h/2 ( c_n (n.r)^2 + c_t |r - (n.r) n|^2 ),   r = (p - p^n)/h - w,
 *              p the centroid
 *
 * |u|, n and A are lagged to the start of the step, r is not: the force is linear in the new
 * velocity and P is convex, so the lightest cloth in a storm is stable at any step. For drag and
 * lift equal the force is the plain c |u| (w - v). The tangential coefficient is called lift as
 * in the cloth literature's two-parameter models (normal and tangential drag); true aerofoil
 * lift, perpendicular to the flow, results from c_n > c_t. Where there is no h (statics, LEAPFROG,
 * cloth_sim_potential) r is taken at v^n: a constant force f, P = -f.(p - p^n), no Hessian. */

/* Velocity of the centroid of the face v [3] relative to the air: over a substep of h, or at its
 * start when h = 0. */
static void clothi_wind_air(const cloth_eval *e, const int *v, double h, double *u) {
    int j, k;
    for (k = 0; k < 3; k++) {
        double sum = 0;
        for (j = 0; j < 3; j++)
            sum += h > 0 ? (e->x[3 * v[j] + k] - e->x_n[3 * v[j] + k]) / h : e->v_n[3 * v[j] + k];
        u[k] = sum / 3 - e->in->wind[k];
    }
}

static cloth_status clothi_wind_begin(void *user, const cloth_eval *e) {
    clothi_own        *own = (clothi_own *)user;
    const cloth_model *m = e->model;
    int                f, k;
    if (!e->in->wind_on) return CLOTH_OK;
    own->counts.wind_faces += m->nf;
    for (f = 0; f < m->nf; f++) {
        const int *v = m->faces + 3 * f;
        double    *w = own->wind + 5 * (size_t)f, n[3], u[3], len, speed;
        clothi_face_cross(e->x_n, v, n);
        clothi_wind_air(e, v, 0, u);
        len = sqrt(clothi_dot3(n, n));
        speed = sqrt(clothi_dot3(u, u));
        for (k = 0; k < 3; k++) w[k] = len > 0 ? n[k] / len : 0;
        w[3] = 0.5 * m->desc.air_density * m->desc.drag * 0.5 * len * speed;
        w[4] = 0.5 * m->desc.air_density * m->desc.lift * 0.5 * len * speed;
    }
    return CLOTH_OK;
}

/* That velocity at x: its parts along n and across. */
static double clothi_wind_slip(const clothi_own *own, const cloth_eval *e, int f, double *r) {
    const double *n = own->wind + 5 * (size_t)f;
    double        along;
    int           k;
    clothi_wind_air(e, e->model->faces + 3 * f, e->h, r);
    along = clothi_dot3(n, r);
    for (k = 0; k < 3; k++) r[k] -= along * n[k];
    return along;
}

CLOTHI_RARE_END

static cloth_status clothi_wind_eval(void *user, const cloth_eval *e, double *energy) {
    clothi_own  *own = (clothi_own *)user;
    cloth_status status;
    double       sum = 0;
    int          f, j, k;
    *energy = 0;
    if (!e->in->wind_on) return CLOTH_OK;
    for (f = 0; f < e->model->nf; f++) {
        const double *n = own->wind + 5 * (size_t)f;
        const int    *v = e->model->faces + 3 * f;
        double        r[3], along = clothi_wind_slip(own, e, f, r), H[81];
        if (e->h > 0) sum += 0.5 * e->h * (n[3] * along * along + n[4] * clothi_dot3(r, r));
        for (j = 0; j < 9; j++) {
            int    i = 3 * v[j / 3] + j % 3;
            double g = (n[3] * along * n[j % 3] + n[4] * r[j % 3]) / 3;
            if (!(e->h > 0)) sum += g * (e->x[i] - e->x_n[i]);
            if (e->grad) e->grad[i] += g;
        }
        if (!e->hess || !(e->h > 0)) continue;
        for (j = 0; j < 9; j++)
            for (k = 0; k < 9; k++)
                H[9 * j + k] = ((n[3] - n[4]) * n[j % 3] * n[k % 3] +
                                (j % 3 == k % 3 ? n[4] : 0)) / (9 * e->h);
        status = cloth_matrix_add_element(e->hess, 3, v, H);
        if (status) return status;
    }
    own->counts.wind_faces += e->model->nf;
    *energy = sum;
    return CLOTH_OK;
}

/* --- vjp of the elements ---
 *
 * The lanes differentiate V = a.f by the numbers of `rest`; from there the transpose of [8.2]'s
 * derivation leads to params. d: of one element, CLOTHI_LANES apart. */

CLOTHI_RARE_BEGIN

/* dV/d(rest edge^2 of face f) and dV/d(area of f) into its corners in X [nf x 3 x 2]. */
CLOTHI_OUTLINE static void clothi_rest_vjp(const cloth_model *m, const cloth_params *p, int f,
                                           int va, int vb, double de2, double dA, double *X) {
    const size_t  a = clothi_corner(m, f, va), b = clothi_corner(m, f, vb), at = 6 * (size_t)f;
    const double *c = p->X + at;
    int           k;
    for (k = 0; k < 2; k++) {
        double d = 2 * de2 * (p->X[b + (size_t)k] - p->X[a + (size_t)k]);
        X[b + (size_t)k] += d;
        X[a + (size_t)k] -= d;
    }
    for (k = 0; k < 3; k++) {               /* 2 A = sum of cross products around */
        const double *q = c + 2 * ((k + 1) % 3), *r = c + 2 * ((k + 2) % 3);
        X[at + 2 * (size_t)k] += 0.5 * dA * (q[1] - r[1]);
        X[at + 2 * (size_t)k + 1] += 0.5 * dA * (r[0] - q[0]);
    }
}

static void clothi_triangle_params_vjp(const cloth_eval *e, int f, const double *d, double dtau,
                                cloth_vjp *out) {
    const int region = e->model->region[f];
    int       k;
    if (out->mu) out->mu[region] += d[5 * CLOTHI_LANES];
    if (out->lambda) out->lambda[region] += d[6 * CLOTHI_LANES];
    if (out->damping) out->damping[region] += dtau;
    for (k = 0; out->X && k < 4; k++) {
        out->X[6 * (size_t)f + (size_t)(2 + k)] += d[k * CLOTHI_LANES];
        out->X[6 * (size_t)f + (size_t)(k % 2)] -= d[k * CLOTHI_LANES];
    }
}

/* k = Y (A1 + A2)/L^2 and Y = 4 mu (lambda + mu)/(lambda + 2 mu) carry V to mu, lambda and X. */
static void clothi_spring_params_vjp(const cloth_eval *e, int i, const double *rest,
                                     const double *d, double dtau, cloth_vjp *out) {
    const cloth_model *m = e->model;
    const int *v = m->topology->edges + 2 * (size_t)i, *f = m->topology->edge_faces + 2 * (size_t)i;
    const double k = rest[0], L = rest[CLOTHI_LANES], V = d[0], dL = d[CLOTHI_LANES];
    int          j, n = f[1] >= 0 ? 2 : 1;
    for (j = 0; j < n && k > 0; j++) {
        int                   region = m->region[f[j]];
        const cloth_material *mat = e->params->material + region;
        double A = clothi_rest_area(e->params->X, f[j]), mu, la, q;
        cloth_material_lame(mat, &mu, &la);
        q = la + 2 * mu;
        if (out->mu)
            out->mu[region] += V * A / (L * L) * 4 * (la * la + 2 * la * mu + 2 * mu * mu) /
                               (q * q);
        if (out->lambda) out->lambda[region] += V * A / (L * L) * 4 * mu * mu / (q * q);
        if (out->damping) out->damping[region] += dtau / n;
        if (out->X)
            clothi_rest_vjp(m, e->params, f[j], v[0], v[1],
                            (-V * k / (L * L) + 0.5 * dL / L) / n,
                            V * clothi_young(mat) / (L * L), out->X);
    }
}

/* dV/dw [4], CLOTHI_LANES apart, through face k's share (q, t) of the weights into its corners. */
static void clothi_quadratic_face_vjp(const cloth_model *m, const cloth_params *p, int h, int k,
                                      const double *dw, double *X) {
    enum { L = CLOTHI_LANES };
    const int   *v = m->topology->hinges + 4 * (size_t)h;
    const int    f = m->topology->hinge_faces[2 * (size_t)h + (size_t)k];
    double       q, t, e[2], d[2], *a = X + clothi_corner(m, f, v[0]);
    double      *b = X + clothi_corner(m, f, v[1]), *c = X + clothi_corner(m, f, v[2 + k]);
    const double e2 = clothi_quadratic_face(m, p->X, h, k, e, d, &q, &t);
    const double dq = (1 - t) * dw[0] + t * dw[L] - dw[(2 + k) * L], dt = q * (dw[L] - dw[0]);
    int          i;
    clothi_rest_vjp(m, p, f, v[0], v[1], dq * q / (2 * e2), -dq * q / clothi_rest_area(p->X, f), X);
    for (i = 0; i < 2; i++) {
        double de = dt * (d[i] - 2 * t * e[i]) / e2, dd = dt * e[i] / e2;
        b[i] += de;
        c[i] += dd;
        a[i] -= de + dd;
    }
}

/* c = scale D e2/(A1 + A2), D and tau the means of the two faces' materials; then theta0 or w. */
static void clothi_bend_params_vjp(const cloth_eval *e, int h, const double *d, double dtau,
                                   cloth_vjp *out) {
    const cloth_model *m = e->model;
    const int         *v = m->topology->hinges + 4 * (size_t)h;
    const int         *f = m->topology->hinge_faces + 2 * (size_t)h;
    clothi_hinge_rest  r = clothi_hinge_of(m, e->params, h);
    const double       A = r.A1 + r.A2, unit = r.e2 / A, scale = e->params->hinge_scale[h];
    const int          quadratic = m->bend.kind == CLOTHI_QUADRATIC;
    int                k;
    if (out->theta0 && !quadratic) out->theta0[h] += d[CLOTHI_LANES];
    if (out->hinge_scale) out->hinge_scale[h] += d[0] * r.bending * unit;
    for (k = 0; k < 2; k++) {
        if (out->bending) out->bending[m->region[f[k]]] += 0.5 * d[0] * scale * unit;
        if (out->damping) out->damping[m->region[f[k]]] += 0.5 * dtau;
        if (!out->X) continue;
        clothi_rest_vjp(m, e->params, f[k], v[0], v[1], 0.5 * d[0] * scale * r.bending / A,
                        -d[0] * scale * r.bending * unit / A, out->X);
        if (quadratic)
            clothi_quadratic_face_vjp(m, e->params, h, k, d + CLOTHI_LANES, out->X);
    }
}

/* dV by the numbers of batch b's rest, d, and by its tau, to params. */
static void clothi_batch_params_vjp(const clothi_elements *el, const cloth_eval *e, int b,
                                    const double *d, const double *dtau, cloth_vjp *out) {
    enum { L = CLOTHI_LANES };
    const clothi_group *g = el->group;
    const double       *rest = el->rest + (size_t)b * (size_t)el->kind->nrest * L;
    int                 k, id;
    for (k = 0; k < L; k++) {
        if ((id = g->id[b * L + k]) < 0) continue;
        if (g->kind == CLOTHI_TRIANGLE)
            clothi_triangle_params_vjp(e, id, d + k, dtau[k], out);
        else if (g->kind == CLOTHI_SPRING)
            clothi_spring_params_vjp(e, id, rest + k, d + k, dtau[k], out);
        else clothi_bend_params_vjp(e, id, d + k, dtau[k], out);
    }
}

/* damp = tau/h: by tau, h and x^n here, by the rest above. */
static cloth_status clothi_elements_vjp(void *user, const cloth_eval *e, const double *a,
                                        cloth_vjp *out) {
    enum { L = CLOTHI_LANES };
    const clothi_elements *el = (const clothi_elements *)user;
    const clothi_group    *g = el->group;
    const double           inv_h = e->h > 0 ? 1 / e->h : 0, *rest, *start;
    double x[12 * L], x_n[12 * L], y[12 * L], damp[L], d[7 * L], dtau[L], d_x_n[12 * L], Ha[12 * L];
    int    b, k, j;
    for (b = 0; b < g->nbatch; b++) {
        const int *v = g->vert + (size_t)b * (size_t)g->width * L;
        clothi_corners(g, e->x, b, x);
        clothi_corners(g, inv_h > 0 ? e->x_n : e->x, b, x_n);
        clothi_corners(g, a, b, y);
        clothi_batch_rest(el, b, inv_h, &rest, &start, damp);
        el->kind->vjp(x, x_n, y, rest, damp, d, dtau, d_x_n, Ha);
        for (k = 0; k < L; k++) {
            dtau[k] *= inv_h;
            if (g->id[b * L + k] < 0) continue;
            if (out->h) *out->h -= dtau[k] * damp[k];
            for (j = 0; out->x_n && damp[k] > 0 && j < 3 * g->width; j++)
                out->x_n[3 * v[j / 3 * L + k] + j % 3] += d_x_n[j * L + k];
        }
        clothi_batch_params_vjp(el, e, b, d, dtau, out);
    }
    return CLOTH_OK;
}

/* --- vjp of wind --- */

/* P depends on w, on x_n, v_n through |u|, n, A and r, and on h through r; at h = 0 r is at v_n.
 * Exact for w, for h and for r; the lagged |u|, n and A are differentiated too: with
 * c = 1/2 rho A |u|,  d(c) = c (d|u|/|u| + dA/A),  d|u| = u.du/|u|,  dA = n.dN/2,
 * dn = (I - n n') dN/(2A) where N = (x1 - x0) x (x2 - x0). */
static cloth_status clothi_wind_vjp(void *user, const cloth_eval *e, const double *a,
                                    cloth_vjp *out) {
    const clothi_own  *own = (const clothi_own *)user;
    const cloth_model *m = e->model;
    int                f, j, k;
    double            *slip = e->h > 0 ? out->x_n : out->v_n;   /* what r depends on */
    const double       rate = e->h > 0 ? -1 / (3 * e->h) : 1.0 / 3;
    if (!e->in->wind_on) return CLOTH_OK;
    for (f = 0; f < m->nf; f++) {
        const double *w = own->wind + 5 * (size_t)f;
        const int    *v = m->faces + 3 * f;
        double r[3], t[3], ap[3], u[3], along, speed2, an, work, gn[3], gN[3], len2, along_n;
        double e1[3], e2[3], N[3], g1[3], g2[3], tangent_a;
        along = clothi_wind_slip(own, e, f, t);
        clothi_wind_air(e, v, 0, u);
        speed2 = clothi_dot3(u, u);
        for (k = 0; k < 3; k++) {
            r[k] = t[k] + along * w[k];
            ap[k] = (a[3 * v[0] + k] + a[3 * v[1] + k] + a[3 * v[2] + k]) / 3;
        }
        an = clothi_dot3(ap, w);
        tangent_a = clothi_dot3(ap, r) - an * along;
        work = w[3] * an * along + w[4] * tangent_a;       /* ap . force coefficient */
        for (k = 0; k < 3; k++) {           /* r: at fixed coefficients */
            double dr = w[3] * an * w[k] + w[4] * (ap[k] - an * w[k]);
            if (out->wind) out->wind[k] -= dr;
            for (j = 0; slip && j < 3; j++) slip[3 * v[j] + k] += dr * rate;
            if (out->h && e->h > 0) *out->h -= dr * (r[k] + e->in->wind[k]) / e->h;
            if (speed2 > 0) {               /* |u| */
                if (out->wind) out->wind[k] -= work * u[k] / speed2;
                for (j = 0; out->v_n && j < 3; j++)
                    out->v_n[3 * v[j] + k] += work * u[k] / speed2 / 3;
            }
            /* n: d(work)/dn at fixed coefficients */
            gn[k] = (w[3] - w[4]) * (ap[k] * along + an * r[k]);
        }
        if (!out->x_n) continue;
        clothi_sub3(e->x_n + 3 * v[1], e->x_n + 3 * v[0], e1);
        clothi_sub3(e->x_n + 3 * v[2], e->x_n + 3 * v[0], e2);
        clothi_cross3(e1, e2, N);
        len2 = clothi_dot3(N, N);
        if (!(len2 > 0)) continue;
        along_n = clothi_dot3(gn, w);
        for (k = 0; k < 3; k++)             /* n and A through N */
            gN[k] = (gn[k] - along_n * w[k]) / sqrt(len2) + work * w[k] / sqrt(len2);
        clothi_cross3(e2, gN, g1);
        clothi_cross3(gN, e1, g2);
        for (k = 0; k < 3; k++) {
            out->x_n[3 * v[1] + k] += g1[k];
            out->x_n[3 * v[2] + k] += g2[k];
            out->x_n[3 * v[0] + k] -= g1[k] + g2[k];
        }
    }
    return CLOTH_OK;
}

/* --- the list --- */

static void clothi_terms_install(cloth_sim *s) {
    static const cloth_term list[CLOTHI_TERM_HOST] = {
        {"stretch", NULL, clothi_elements_begin, clothi_elements_eval, clothi_elements_vjp, NULL,
         NULL, NULL, 0},
        {"bend", NULL, clothi_elements_begin, clothi_elements_eval, clothi_elements_vjp, NULL, NULL,
         NULL, 0},
        {"gravity", NULL, NULL, clothi_gravity_eval, clothi_gravity_vjp, NULL, NULL, NULL, 0},
        {"force", NULL, NULL, clothi_force_eval, clothi_force_vjp, NULL, NULL, NULL, 0},
        {"attachment", NULL, NULL, clothi_attach_eval, clothi_attach_vjp, NULL, NULL, NULL, 0},
        {"wind", NULL, clothi_wind_begin, clothi_wind_eval, clothi_wind_vjp, NULL, NULL, NULL, 0}};
    int i;
    memcpy(s->term, list, sizeof list);
    s->term[CLOTHI_TERM_MEMBRANE].user = &s->own.membrane;
    s->term[CLOTHI_TERM_BEND].user = &s->own.bend;
    for (i = CLOTHI_TERM_GRAVITY; i < CLOTHI_TERM_HOST; i++) s->term[i].user = &s->own;
    s->nbuiltin = s->nterms = CLOTHI_TERM_HOST;
}

/* ===== [9.2] NEWTON ==========================================================================
 *
 *   minimise   phi(x) = 1/(2 eta^2) |x - y|^2_M + E_pot(x)         over the unpinned unknowns
 *
 *   gradient   g = M (x - y)/eta^2 + dE/dx                              N
 *   Hessian    H = M/eta^2 + d2E/dx2                                    N/m
 *   iterate    H dx = -g (inexactly: CG to a relative tolerance), x <- x + a dx
 *
 * Why a step is a minimum. grad phi = 0 reads M (x - y)/eta^2 = -dE/dx: for implicit Euler, y =
 * x^n + h v^n and eta = h, this is M (v - v^n)/h = f(x) with v = (x - x^n)/h. Energies compare
 * where equations do not: of two trial points the lower one is the better.
 *
 * Why Newton is fast, and when not. Near the solution x* put e = x - x*. Taylor at x: 0 = grad
 * phi(x*) = g - H e + O(|e|^2), so the full step leaves e + dx = e - H^-1 g = O(|e|^2): the digits
 * double. With another matrix B it leaves (I - B^-1 H) e + O(|e|^2): digits only add up. Far away
 * nothing holds. A bar with E = Y (l^2 - 1)^2/8 has g = Y (l^3 - l)/2, H = Y (3 l^2 - 1)/2: its
 * step -(l^3 - l)/(3 l^2 - 1) leads from 0.60 to 5.40, and below 1/sqrt(3), where H < 0, away from
 * 1 altogether. What helps: g.dx = -g'H^-1 g < 0, downhill, is sure only when H is definite; then
 * a short enough step lowers phi (examples/06_newton.c).
 *
 * Which Hessian. The exact one converges quadratically but is indefinite where cloth is
 * compressed; far from the minimum its directions are wasted. So the iterations begin with a
 * definite model (hinges Gauss-Newton, negative principal stresses reflected, [6.2]) and turn
 * to the exact Hessian when the updates have become small: below CLOTHI_EXACT edges, or from
 * iteration CLOTHI_LATE on below CLOTHI_EXACT_LATE edges. There CG runs inside a trust region
 * (Steihaug [NW06]): where it meets negative curvature it follows it to the radius, which is
 * also how saddles are left; CHOLESKY hands an iteration with negative pivots to it.
 * Contact has kinks, where a touch begins and where friction slips, and cloth that is pushed
 * together grows wrinkles through all of a step: directions of negative curvature are many, and
 * each leads CG to the radius after an iteration or two. With contact the exact Hessian is for
 * tolerances below CLOTHI_EXACT_TOUCH of where its phase begins, and CLOTHI_STUCK updates of it in
 * a row that end at the radius, or short of their length, are followed by one of the definite
 * model, which has no radius and does not end the search. For others there is the definite model
 * alone, in which negative stresses are left out: reflected, they shorten the update that ends it.
 * Its digits only add up, so that CLOTHI_ALONE cg_tolerances do for its solves.
 *
 * Which stress. An update that turns triangles strains them by 1/2 dF'dF more than the matrix
 * predicted: a tension that no load asks for and that the next update takes away. In the geometric
 * term (g_i' S g_j) I [6.2] it would make that update too short, the more so the stiffer cloth is.
 * So the definite model takes S of the predicted strain there, as mixed methods do, which iterate
 * on stresses too [MLG17]; value, gradient and exact Hessian are those of x. Not with contact,
 * where it brought little, and searches from what a zone has strained ended higher (bench_hard.c).
 *
 * Line search. a = 1, 1/2, 1/4, ... until phi(x + a dx) <= phi(x) + 1e-4 a g.dx (Armijo
 * [NW06]). a = 1 is nearly always accepted, so each trial evaluates value and gradient in one
 * pass, and the next iteration needs the Hessian only. Near the minimum the decrease drowns in
 * the rounding of phi, of the order eps * (|inertia| + sum |terms|): that much is forgiven.
 * Where stiff and hardly strained, phi is rougher than that (strain is known to eps, so phi to eps
 * times force times position): a whole update below CLOTHI_TINY edges may show its decrease by the
 * slopes at its two ends instead, which have no such cancellation.
 *
 * Starting guess. x^n + h (3/2 v^n - 1/2 v^(n-1)), without history x^n + h v^n. The older velocity
 * is part of the state for that reason. Where that made energy, x^n: clothi_booked() [9.5].
 *
 * When to stop. The last update, max|dx| of all of it and not of the part a that descends, is below
 * desc.tolerance (m), and it came from the exact Hessian: the definite model errs towards short
 * updates, most of all where the sheet is about to buckle, and would stop at a saddle as well. It
 * has the last word only where the exact one led nowhere. A search at negative curvature must not
 * stop, however small its radius, unless phi falls nowhere within a tenth of the tolerance; that a
 * host's wall cuts its update is no sign of it. So the way left to the minimum ahead is near the
 * tolerance or below it, but for a plateau where a minimum has just vanished. Where one vertex has
 * nearly all of the residual, CG ends before the others have moved: what it leaves, in the norm of
 * -g.dx = dx'H dx, is to be below the tolerance too, in the root mean square by mass.
 * With contact single vertices slide on kinks and buckle on while nothing else moves. There an
 * update that no pair cuts also ends the search when it is below the tolerance in the root mean
 * square by mass, even as H measures it: -g.dx = dx'H dx >= |dx|_M^2/eta^2, at most (a
 * tolerance)^2 sum m/eta^2, of the part a that descends: at rest it is halved over kinks 1e-9 m
 * wide for ever. And contact is asked whether what is left is small beside its friction.
 *
 * Saddles. Where a diagonal block of the exact Hessian is not positive, as in cloth pressed below
 * 0.577 of its length, the usual preconditioner is none, and the definite model has the word, which
 * ends on a saddle as well. And a compressed sheet exactly in a plane across an axis feels no force
 * along it. So where the search would end by the definite model, or with an axis along which
 * nothing has moved, and some face is compressed, a force of noise is solved for with the exact
 * Hessian, CG preconditioned by bounds of such blocks: it meets what negative curvature there is,
 * and along that phi is made less. CLOTHI_ESCAPES times a substep: more often loses.
 *
 * A cloth at rest stops before the first linear solve: for a convex E_pot the way e to the minimum
 * has |e|_M^2/eta^2 <= -e.g <= |e|_M |g|_(M^-1), as phi is then at least as convex as its inertia;
 * so that
 * eta^2 |g_i|/m_i <= CLOTHI_REST * tolerance for all i proves the update negligible at the price
 * of one gradient. With the eta of a tiny step a cloth let go would never begin to fall, so that
 * eta counts as CLOTHI_REST_TIME at least. What pulls less than that for ever is never felt: at the
 * default tolerance 3.6e-4 m/s^2, of a free sheet 18 mm in 10 s.
 *
 * What each of these choices is worth, and what was tried and lost: tests/bench/bench_hard.c.
 * checked: tests/test_newton.c, tests/test_step.c
 */

#define CLOTHI_NEWTON_CAP   1000            /* iterations of a substep before it has stalled   */
#define CLOTHI_RETAKES      5               /* of a step [9.5], the last without max_newton    */
#define CLOTHI_CONTACT_CAP  60              /* the same with contact: then accepted            */
#define CLOTHI_FALLS        1e-3            /* ... but where the step gains energy: while phi
                                               falls by this part of K^n an iteration          */
#define CLOTHI_HALVINGS     40
#define CLOTHI_ARMIJO       1e-4
#define CLOTHI_REST         1e-3            /* of the tolerance                                */
#define CLOTHI_REST_TIME    (1.0 / 60)      /* s: see 'When to stop'                           */
#define CLOTHI_TINY         1e-6            /* mean edges: updates judged by slopes too        */
#define CLOTHI_HIDDEN       1e-12           /* of phi: a decrease that its rounding hides      */
#define CLOTHI_LOST         1e-6            /* the same in statics: may hide                   */
#define CLOTHI_EXACT        1.2e-2          /* mean edges: updates below it take the exact H   */
#define CLOTHI_EXACT_LATE   6e-2            /* the same from iteration CLOTHI_LATE on          */
#define CLOTHI_EXACT_TOUCH  0.1                 /* of that: tolerance that asks, in contact   */
#define CLOTHI_ALONE        2               /* cg_tolerances: solves of the definite model alone */
#define CLOTHI_STUCK        4               /* see 'Which Hessian'                             */
#define CLOTHI_LATE         12
#define CLOTHI_ESCAPES      4               /* a substep: see 'Saddles'                        */
#define CLOTHI_ESCAPE       0.01            /* mean edges: first length of a way off a saddle  */
#define CLOTHI_TRUST_MAX    0.3             /* mean edges: largest trust radius                */

typedef struct clothi_goal {                /* what a substep minimises                        */
    cloth_eval e;
    double     eta;                         /* s; 0: no inertia (statics)                      */
    double     sigma;                       /* 1/s^2, extra diagonal sigma m of the solve      */
    double     magnitude;                   /* J, sum of absolute parts of the last value      */
} clothi_goal;

/* The matrix begins empty, or as the Hessian of quadratic bending, which is constant: made once. */
static cloth_status clothi_matrix_start(cloth_sim *s) {
    const clothi_group *g = &s->model->bend;
    const size_t        n = clothi_matrix_doubles(s->matrix);
    cloth_status        status;
    double              H[54 * CLOTHI_LANES];
    int                 b;
    cloth_matrix_clear(s->matrix);
    if (g->kind != CLOTHI_QUADRATIC || !g->count || s->own.tau > 0) return CLOTH_OK;
    status = clothi_need(s, &s->quadratic, n);
    if (s->quadratic_ready) memcpy(s->matrix->diag, s->quadratic, n * sizeof(double));
    if (status || s->quadratic_ready) return status;
    for (b = 0; b < g->nbatch; b++) {
        clothi_quadratic_blocks(clothi_none, clothi_none,
                                s->own.bend.rest + (size_t)b * 5 * CLOTHI_LANES, clothi_none,
                                clothi_none, 0, H);
        clothi_scatter(g, s->matrix, b, H);
    }
    memcpy(s->quadratic, s->matrix->diag, n * sizeof(double));
    s->quadratic_ready = 1;
    s->own.counts.bend_assemblies++;
    return CLOTH_OK;
}

/* --- ties: with T the map from leaders to all unknowns, T' H T in place --- */

/* Moves entries (i, j) of the block of vertices u, v that name a follower to those of the leaders.
 * A block off the diagonal stands for its mirror image too; diagonal blocks hold both triangles. */
static cloth_status clothi_tie_block(cloth_sim *s, double *block, int u, int v) {
    const int   *tie = s->model->tie;
    cloth_status status = CLOTH_OK;
    int          a, b;
    for (a = 0; a < 3; a++)
        for (b = 0; b < 3 && !status; b++) {
            const int    i = tie[3 * u + a] >= 0 ? 3 * tie[3 * u + a] + a : 3 * u + a;
            const int    j = tie[3 * v + b] >= 0 ? 3 * tie[3 * v + b] + b : 3 * v + b;
            const double h = block[3 * a + b];
            if ((i == 3 * u + a && j == 3 * v + b) || !(fabs(h) > 0)) continue;
            block[3 * a + b] = 0;
            if (i / 3 == j / 3) {
                double *to = clothi_matrix_diag(s->matrix, i / 3);
                to[3 * a + b] += h;
                if (u != v) to[3 * b + a] += h;
            } else {                        /* and at (j, i) */
                const int to[2] = {j / 3, i / 3};
                double    H[36] = {0};
                H[6 * (3 + a) + b] = u == v ? 0.5 * h : h;
                status = cloth_matrix_add_element(s->matrix, 2, to, H);
            }
        }
    return status;
}

static cloth_status clothi_tie_matrix(cloth_sim *s) {
    cloth_matrix        *A = s->matrix;
    const cloth_pattern *p = A->p;
    const int            ne = A->ne;
    cloth_status         status = CLOTH_OK;
    int                  i, k, d;
    for (i = 0; i < p->n && !status; i++) {
        const int u = p->vertex_of[i];
        status = clothi_tie_block(s, clothi_matrix_diag(A, u), u, u);
        for (d = i < p->dom[p->nd] ? p->nd : 0; d <= p->nd; d++) {
            const int q = d < p->nd ? clothi_shared(p, d, i) : p->own[i];
            for (k = p->start[q]; k < p->start[q + 1] && !status; k++)
                status = clothi_tie_block(s, A->low + 9 * (size_t)k, u, p->vertex_of[p->col[k]]);
        }
    }
    for (k = 0; k < ne && !status; k++) {   /* pairs outside the pattern; the list may grow    */
        double block[9];
        memcpy(block, A->extra + 9 * (size_t)k, sizeof block);
        status = clothi_tie_block(s, block, p->vertex_of[A->pair[2 * k]],
                                  p->vertex_of[A->pair[2 * k + 1]]);
        memcpy(A->extra + 9 * (size_t)k, block, sizeof block);
    }
    return status;
}

/* From here on time counts as *to; returns what it counted as. */
static double *clothi_charge(cloth_sim *s, double *to) {
    const double now = clothi_now(&s->hooks);
    double      *was = s->charged;
    if (was) *was += 1e3 * (now - s->since);
    s->charged = to, s->since = now;
    return was;
}

/* phi at x; value, gradient [nv x 3] and the matrix as asked (NULL, 0: not). */
CLOTHI_OUTLINE static cloth_status clothi_objective(cloth_sim *s, clothi_goal *goal,
                                                    const double *x, double *grad, int hess,
                                                    int psd, double *value) {
    const cloth_model *m = s->model;
    int             chunks = (m->nv + CLOTHI_VERTICES - 1) / CLOTHI_VERTICES, i;
    clothi_vertices q;
    cloth_status    status = CLOTH_OK;
    double          sum = 0, magnitude = 0, w = goal->eta > 0 ? 1 / (goal->eta * goal->eta) : 0;
    q.s = s, q.w = w, q.x = x, q.grad = grad, q.partial = s->w.partial;
    goal->e.x = x;
    goal->e.grad = grad;
    goal->e.hess = hess ? s->matrix : NULL;
    goal->e.psd = psd;
    s->own.force_only = value == NULL;
    s->fresh = 0;
    if (hess) status = clothi_matrix_start(s);
    for (i = 0; i < s->nterms && !status; i++) {
        if (i == CLOTHI_TERM_BEND + 1) {    /* element forces first: gathering sets, not adds */
            if (grad) clothi_gather_forces(s, grad);
            if (hess) clothi_matrix_close(s->matrix, s->params.mass, w + goal->sigma);
            if (grad || value) clothi_for(&s->hooks, chunks, 1, clothi_inertia_range, &q);
        }
        status = s->term[i].eval(s->term[i].user, &goal->e, &s->term_energy[i]);
        sum += s->term_energy[i];
        magnitude += fabs(s->term_energy[i]);
    }
    if (!status && s->contact_on) {
        double *was = clothi_charge(s, &s->ms.contact);
        s->own.counts.contact_calls++;
        if (grad && s->w.free) memcpy(s->w.free, grad, 3 * (size_t)m->nv * sizeof(double));
        status = s->contact.eval(s->contact.user, &goal->e, &s->contact_energy);
        (void)clothi_charge(s, was);
        sum += s->contact_energy;
        magnitude += fabs(s->contact_energy);
    }
    for (i = 0; i < chunks; i++) {
        sum += s->w.partial[i];
        magnitude += s->w.partial[i];
    }
    s->own.force_only = 0;
    if (value) *value = sum, goal->magnitude = magnitude;
    return status;
}

/* --- ties: T' g and T dx --- */

static void clothi_tie_gradient(const cloth_model *m, double *g) {
    int i;
    for (i = 0; m->tie && i < 3 * m->nv; i++)
        if (m->tie[i] >= 0) {
            g[3 * m->tie[i] + i % 3] += g[i];
            g[i] = 0;
        }
}

/* Followers to where their leaders have them. */
static void clothi_tie_place(const cloth_model *m, double *x) {
    int i;
    for (i = 0; m->tie && i < 3 * m->nv; i++)
        if (m->tie[i] >= 0) {
            const int lead = 3 * m->tie[i] + i % 3;
            x[i] = x[lead] + (m->x[i] - m->x[lead]);
        }
}

static void clothi_tie_spread(const cloth_model *m, double *dx) {
    int i;
    for (i = 0; m->tie && i < 3 * m->nv; i++)
        if (m->tie[i] >= 0) dx[i] = dx[3 * m->tie[i] + i % 3];
}

/* --- one iteration --- */

typedef struct clothi_newton {              /* progress of one minimisation                    */
    double value;                           /* J, phi(x)                                       */
    double slope;                           /* J, g.dx < 0                                     */
    double size;                            /* m, max|dx| of the last solve                    */
    double radius;                          /* m, trust radius of the exact phase              */
    int    exact;                           /* the exact Hessian is in use                     */
    int    escapes;                         /* searches for a way off a saddle                 */
    int    refused;                         /* it was tried and led nowhere                    */
    int    stuck;                           /* exact updates in a row that the radius ended    */
    int    poor;                            /* phi falls nowhere within the least radius       */
    int    walls;                           /* an update was halved: hinges show theirs        */
    const double *was;                      /* the iterate before, until the next solve; NULL  */
    int    done;
} clothi_newton;

/* Largest |w.rhs| / m, m/s^2. */
static double clothi_newton_pull(const cloth_sim *s) {
    double big = 0;
    int    i;
    for (i = 0; i < 3 * s->model->nv; i++)
        big = clothi_max(big, fabs(s->w.rhs[i]) / s->params.mass[i / 3]);
    return big;
}

/* rhs = -g over leaders and free unknowns. */
CLOTHI_OUTLINE static void clothi_newton_rhs(cloth_sim *s) {
    double *r = s->w.rhs;
    int     i, k;
    memcpy(r, s->w.grad, 3 * (size_t)s->model->nv * sizeof(double));
    clothi_tie_gradient(s->model, r);
    for (i = 0; i < s->model->nv; i++, r += 3)
        for (k = 0; k < 3; k++) r[k] = s->fixed[i] >> k & 1 ? 0 : -r[k];
}

/* Numbers a [nv x 3] are finite; the vertex of one that is not goes into the report. */
static cloth_status clothi_check_vertices(cloth_sim *s, const char *name, const double *a) {
    const ptrdiff_t at = clothi_find_nonfinite(a, 3 * (size_t)s->model->nv);
    if (at < 0) return CLOTH_OK;
    s->report.vertex = (int)(at / 3);
    return clothi_fail(&s->hooks, CLOTH_ERR_NONFINITE, "%s[%i] = %g (vertex %i)", name, (int)at,
                       a[at], s->report.vertex);
}

/* Each element is finite by promise: their sum, a host's term or contact need not be. */
static cloth_status clothi_check_terms(cloth_sim *s, double value) {
    const cloth_status status = clothi_check_vertices(s, "gradient of the terms", s->w.grad);
    if (status || clothi_finite(value)) return status;
    return clothi_fail(&s->hooks, CLOTH_ERR_NONFINITE, "the energy of the terms is %g", value);
}

/* phi(x + a dx) and its gradient for a, a/2, ...; leaves the accepted point in w.trial. A whole
 * update may show its decrease by the slope at its end: see 'Line search'. In statics also where
 * that of a hardly strained sheet is lost in rounding of order eps |force| |x|, not eps phi; and
 * one below the tolerance is taken as it is. */
CLOTHI_OUTLINE static cloth_status clothi_line_search(cloth_sim *s, clothi_goal *goal,
                                                      clothi_newton *nt, double *a) {
    double      *was = clothi_charge(s, &s->ms.line_search);
    double       rounding = 4e-15 * goal->magnitude, value = 0;
    const int    rest = !(goal->eta > 0), still = rest && nt->size < s->model->desc.tolerance;
    const double part = nt->size < CLOTHI_TINY * s->edge ? 1 - 2 * CLOTHI_ARMIJO
                            : rest && -nt->slope <= CLOTHI_LOST * goal->magnitude ? 0.5 : 0;
    cloth_status status = CLOTH_OK;
    int          i, k, n = 3 * s->model->nv;
    for (k = 0; k <= CLOTHI_HALVINGS; k++, *a *= 0.5) {
        for (i = 0; i < n; i++) s->w.trial[i] = s->w.x[i] + *a * s->w.dx[i];
        status = clothi_objective(s, goal, s->w.trial, s->w.grad, 0, 0, &value);
        if (status || value <= nt->value + CLOTHI_ARMIJO * *a * nt->slope + rounding) break;
        if (k == 0 && (still || (part > 0 && clothi_dot(s->w.grad, s->w.dx, (size_t)n) <=
                                                 -part * nt->slope)))
            break;
        s->report.halvings++;
    }
    (void)clothi_charge(s, was);
    if (status) return status;
    if (k > CLOTHI_HALVINGS && clothi_finite(value)) return CLOTH_ERR_STEP;
    nt->value = value;
    return clothi_check_terms(s, value);
}

/* With contact the exact Hessian is for tolerances far below where its phase begins. */
static int clothi_exact_asked(const cloth_sim *s) {
    return !s->contact_on ||
           s->model->desc.tolerance < CLOTHI_EXACT_TOUCH * CLOTHI_EXACT * s->edge;
}

/* Of a linear solve: see 'Which Hessian'. A half and more stays as it was asked for. */
static double clothi_solve_tolerance(const cloth_sim *s) {
    const double asked = s->model->desc.cg_tolerance;
    return clothi_exact_asked(s) ? asked : clothi_max(asked, clothi_min(CLOTHI_ALONE * asked, 0.5));
}

/* Hessian at w.x: exact, or the definite model, with negative stresses left out where it ends the
 * search by the length of an update. */
CLOTHI_OUTLINE static cloth_status clothi_newton_assemble(cloth_sim *s, clothi_goal *goal,
                                                          int exact) {
    double      *was = clothi_charge(s, &s->ms.assemble);
    const int    psd = exact ? 0 : clothi_exact_asked(s) ? 2 : 1;
    cloth_status status = clothi_objective(s, goal, s->w.x, NULL, 1, psd, NULL);
    s->report.projected += !exact;
    if (!status && s->model->tie) status = clothi_tie_matrix(s);
    (void)clothi_charge(s, was);
    return status;
}

/* But for rounding CG ends after as many iterations as there are unknowns. Where twenty times as
 * many were not enough, rounding never meets the tolerance; the general cap would only cost. */
#define CLOTHI_CG_SMALL 300                 /* vertices                                        */

/* One linear solve, w.dx = H^-1 w.rhs, by `method` where desc.linear leaves it open; radius > 0
 * (m): inside a trust region. */
CLOTHI_OUTLINE static cloth_status clothi_newton_solve(cloth_sim *s, double tolerance,
                                                       double radius, cloth_linear method) {
    double              *was = clothi_charge(s, &s->ms.linear);
    cloth_linear_report *lr = &s->linear;
    cloth_linear_options opt = cloth_linear_options_default();
    cloth_status         status;
    opt.method = s->model->desc.linear, opt.tolerance = tolerance, opt.radius = radius;
    if (opt.method == CLOTH_LINEAR_AUTO || method == CLOTH_LINEAR_JACOBI) opt.method = method;
    opt.fixed = s->fixed;
    if (s->model->nv < CLOTHI_CG_SMALL)
        opt.max_iterations = 60 * s->model->nv + 200;
    status = cloth_linear_solve(s->solver, s->matrix, s->w.rhs, s->w.dx, &opt, lr);
    s->report.factorizations += lr->factorizations;
    s->report.negative += lr->negative;
    if (!status && opt.method == CLOTH_LINEAR_CHOLESKY && lr->negative &&
        (radius > 0 || s->matrix->ne)) {    /* a factor follows no negative curvature: CG does; and
                                               it has not the blocks outside of the pattern    */
        opt.method = CLOTH_LINEAR_SGS;
        status = cloth_linear_solve(s->solver, s->matrix, s->w.rhs, s->w.dx, &opt, lr);
    }
    s->report.linear_solves++;
    s->report.cg += lr->iterations;
    clothi_tie_spread(s->model, s->w.dx);
    (void)clothi_charge(s, was);
    if (status != CLOTH_ERR_NONFINITE || clothi_check_terms(s, 0)) return status;
    return clothi_fail(&s->hooks, status, "the matrix of the linear solve or its answer is not "
                                          "finite: does a pin or an obstacle leap in this step?");
}

/* What there is to know of w.dx before a step along it. */
static void clothi_newton_measure(const cloth_sim *s, clothi_newton *nt) {
    const size_t n = 3 * (size_t)s->model->nv;
    nt->slope = -clothi_dot(s->w.rhs, s->w.dx, n);
    nt->size = clothi_max_abs(s->w.dx, (int)n);
}

/* Hessian and solve: see 'Which Hessian'; the exact one gives way to the definite one where it has
 * negative curvature and no radius was hit. */
static cloth_status clothi_newton_system(cloth_sim *s, clothi_goal *goal, clothi_newton *nt,
                                         double tolerance, cloth_linear method) {
    cloth_status status;
    for (;; nt->exact = 0, nt->refused = 1) {
        s->own.walls = nt->walls, s->own.was = nt->exact ? NULL : nt->was;
        status = clothi_newton_assemble(s, goal, nt->exact);
        s->own.walls = 0, s->own.was = nt->was = NULL;
        if (!status)
            status = clothi_newton_solve(s, tolerance, nt->exact ? nt->radius : 0, method);
        if (status || !nt->exact || !s->linear.negative || s->linear.hit) break;
    }
    s->report.newton++;
    clothi_newton_measure(s, nt);
    return status;
}

/* A direction down; see 'Saddles'. */
static cloth_status clothi_newton_direction(cloth_sim *s, clothi_goal *goal, clothi_newton *nt) {
    cloth_status status = clothi_newton_system(s, goal, nt, clothi_solve_tolerance(s),
                                               CLOTH_LINEAR_SGS);
    int          i, n = 3 * s->model->nv;
    if (status || nt->slope < 0) return status;
    nt->slope = 0;                          /* no descent: the preconditioned gradient is one */
    for (i = 0; i < n; i++) {
        s->w.dx[i] = goal->eta * goal->eta * s->w.rhs[i] / s->params.mass[i / 3];
        nt->slope -= s->w.rhs[i] * s->w.dx[i];
    }
    clothi_tie_spread(s->model, s->w.dx);
    nt->size = clothi_max_abs(s->w.dx, n);
    return CLOTH_OK;
}

/* The radius after a step of length a: how well the quadratic model foretold the decrease. Where
 * rounding hides it, the trapezoid of the slopes at both ends tells it. Never below a tenth of the
 * tolerance: what lowers phi nowhere within that has arrived: nt->poor. */
static void clothi_newton_radius(const cloth_sim *s, const clothi_goal *goal, clothi_newton *nt,
                                 double before, double a) {
    const double least = 0.1 * s->model->desc.tolerance, most = CLOTHI_TRUST_MAX * s->edge;
    double       foretold = s->linear.decrease, got = before - nt->value;
    if (foretold < CLOTHI_HIDDEN * goal->magnitude)
        got = -0.5 * (nt->slope + clothi_dot(s->w.grad, s->w.dx, 3 * (size_t)s->model->nv));
    nt->poor = nt->exact && got < 0.25 * a * foretold && nt->size <= 2 * least;
    if (!nt->exact || a < 1)
        nt->radius = a * nt->size;
    else if (got < 0.25 * foretold)
        nt->radius = 0.5 * nt->size;
    else if (got > 0.75 * foretold && s->linear.hit && nt->radius < 2 * nt->size)
        nt->radius = 2 * nt->size;
    nt->radius = clothi_max(clothi_min(nt->radius, most), least);
}

/* An iterate was accepted: contact renews what it lags, and value and gradient with it; nt->done as
 * for its update. */
static cloth_status clothi_newton_renew(cloth_sim *s, clothi_goal *goal, clothi_newton *nt) {
    const double before = s->contact_energy;
    double      *was;
    cloth_status status;
    if (!s->contact_on) return CLOTH_OK;
    was = clothi_charge(s, &s->ms.contact);
    clothi_newton_rhs(s);
    status = s->contact.update(s->contact.user, s->w.x, s->w.rhs, &nt->done);
    memcpy(s->w.grad, s->w.free, 3 * (size_t)s->model->nv * sizeof(double));
    goal->e.x = s->w.x, goal->e.grad = s->w.grad, goal->e.hess = NULL;
    if (!status) status = s->contact.eval(s->contact.user, &goal->e, &s->contact_energy);
    nt->value += s->contact_energy - before;
    (void)clothi_charge(s, was);
    return status;
}

/* The sentence about a search that came to no end, and the vertex farthest from balance. */
static cloth_status clothi_stalled(cloth_sim *s, const char *what) {
    double big = -1;
    int    i;
    for (i = 0; i < s->model->nv; i++) {
        double f = clothi_dot3(s->w.rhs + 3 * i, s->w.rhs + 3 * i);
        if (f > big) {
            big = f;
            s->report.vertex = i;
        }
    }
    s->report.outcome = CLOTH_STEP_STALLED;
    return clothi_fail(&s->hooks, CLOTH_ERR_STEP,
                       "%s: stalled after %i iterations at t = %g s; last update %g m, largest "
                       "force left %g N at vertex %i", what, s->report.newton, s->state.t,
                       s->report.residual_m, sqrt(clothi_max(big, 0)), s->report.vertex);
}

/* The part of w.dx that contact leaves free. */
static cloth_status clothi_newton_cut(cloth_sim *s, double *a) {
    double      *was;
    cloth_status status;
    if (!s->contact_on) return CLOTH_OK;
    was = clothi_charge(s, &s->ms.contact);
    status = s->contact.max_step(s->contact.user, s->w.x, s->w.dx, a);
    (void)clothi_charge(s, was);
    return status;
}

/* Whether an update ends the search: see 'When to stop'. Statics solve for all of it. */
static int clothi_newton_small(const cloth_sim *s, const clothi_goal *goal,
                               const clothi_newton *nt) {
    const double tolerance = s->model->desc.tolerance, left = goal->eta * s->linear.residual;
    return nt->size < tolerance && -nt->slope * left * left <= s->total * tolerance * tolerance;
}

/* One Newton iteration: w.x moves; nt->done when its update is below the tolerance. */
static cloth_status clothi_newton_iterate(cloth_sim *s, clothi_goal *goal, clothi_newton *nt) {
    double       a = 1, before = nt->value, whole, tiny;
    int          i;
    cloth_status status = clothi_cancelled(&s->hooks, &s->finish);
    if (!status) status = clothi_newton_direction(s, goal, nt);
    if (!status) status = clothi_newton_cut(s, &a);
    if (status) return status;
    whole = a;
    status = clothi_line_search(s, goal, nt, &a);
    if (status == CLOTH_ERR_STEP && clothi_newton_small(s, goal, nt) &&
        !(nt->exact && s->linear.hit)) {    /* the whole update is below the tolerance, and too
                                               small for the value to show it: arrived */
        s->report.residual_m = nt->size;
        nt->done = 1;
        return CLOTH_OK;
    }
    if (status) return status;
    clothi_newton_radius(s, goal, nt, before, a);
    for (i = 0; i < 3 * s->model->nv; i++) {
        const double was = s->w.x[i];
        s->w.x[i] = s->w.trial[i], s->w.trial[i] = was;
    }
    nt->was = s->contact_on ? NULL : s->w.trial;
    s->fresh = !s->contact_on;
    s->report.residual_m = a * nt->size;
    nt->done = clothi_newton_small(s, goal, nt) &&
               (nt->exact ? !s->linear.hit || nt->poor : nt->refused) && nt->stuck >= 0;
    tiny = a * s->model->desc.tolerance;
    if (s->contact_on)                      /* -slope = dx'H dx >= dx'M dx/eta^2; a: overshoot */
        nt->done |= !(whole < 1) &&
                    -nt->slope * goal->eta * goal->eta <= s->total * (tiny * tiny);
    status = clothi_newton_renew(s, goal, nt);
    clothi_newton_rhs(s);
    nt->stuck = s->contact_on && nt->exact && (s->linear.hit || a < 1) ? nt->stuck + 1 : 0;
    nt->walls |= a < whole;
    return status;
}

/* The axis along which the last update moved no free unknown at all, or -1. */
static int clothi_still_axis(const cloth_sim *s) {
    int i, k, n = s->model->nv;
    for (k = 0; k < 3; k++) {
        int unknowns = 0;
        for (i = 0; i < n && !(fabs(s->w.dx[3 * i + k]) > 0); i++)
            unknowns += !(s->fixed[i] >> k & 1);
        if (i == n && unknowns) return k;
    }
    return -1;
}

/* Principal stretches of face f at x [nv x 3], the larger one first, and its corners. Returns the
 * smaller one. */
static double clothi_face_stretch(const cloth_sim *s, const double *x, int f, double *stretch,
                                  double *corners) {
    int k;
    for (k = 0; k < 9; k++) corners[k] = x[3 * s->model->faces[3 * f + k / 3] + k % 3];
    cloth_stretch_state(corners, s->params.X + 6 * (size_t)f, 0, 0, NULL, NULL, NULL, stretch);
    return stretch[1];
}

static int clothi_compressed(const cloth_sim *s) {
    double stretch[2], corners[9];
    int    f = 0;
    while (f < s->model->nf && clothi_face_stretch(s, s->w.x, f, stretch, corners) >= 1 - 1e-9) f++;
    return f < s->model->nf;
}

/* From w.x along +-w.dx: the longest of length, length/4, .. (m) that lowers phi, down to a tenth
 * of the tolerance: nearer some rounding always does. */
static int clothi_escape(cloth_sim *s, clothi_goal *goal, double length, double value) {
    const int    n = 3 * s->model->nv;
    double       turn = length / clothi_max_abs(s->w.dx, n), trial, part = 1;
    int          i, k;
    for (k = 1; length >= 0.1 * s->model->desc.tolerance; k++, length *= fabs(turn)) {
        for (i = 0; i < n; i++) s->w.dx[i] *= turn;
        turn = k % 2 ? -1 : -0.25;          /* the other side, or shorter */
        if (s->contact_on && s->contact.max_step(s->contact.user, s->w.x, s->w.dx, &part)) return 0;
        for (i = 0; i < n; i++) s->w.trial[i] = s->w.x[i] + part * s->w.dx[i];
        if (clothi_objective(s, goal, s->w.trial, NULL, 0, 0, &trial)) return 0;
        if (trial < value - 4e-15 * goal->magnitude) {
            memcpy(s->w.x, s->w.trial, (size_t)n * sizeof(double));
            return 1;
        }
    }
    return 0;
}

/* A force of noise, of `push` m/s^2, leads CG to negative curvature of the matrix where there is
 * any: then it hits the radius. */
static cloth_status clothi_noise(cloth_sim *s, double push, double tolerance, double radius) {
    cloth_status status;
    uint32_t     noise = 1;
    int          i;
    for (i = 0; i < 3 * s->model->nv; i++) {
        noise = noise * 1664525u + 1013904223u;
        s->w.rhs[i] = s->fixed[i / 3] >> i % 3 & 1 ? 0 : push * s->params.mass[i / 3] *
                                                       ((double)(noise >> 8) / 8388608 - 1);
    }
    status = clothi_newton_solve(s, tolerance, radius, CLOTH_LINEAR_SGS);
    if (!status && s->linear.negative && !s->linear.hit)
        status = clothi_newton_solve(s, tolerance, radius, CLOTH_LINEAR_JACOBI);
    return status;
}

/* See 'Saddles'. The force is a thousandth of what inertia needs to move by the radius. Done: there
 * is no negative curvature, or it leads nowhere. */
static cloth_status clothi_off_saddle(cloth_sim *s, clothi_goal *goal, clothi_newton *nt) {
    const double radius = 0.1 * s->model->desc.tolerance;
    cloth_status status;
    if (((nt->exact || !nt->refused) && clothi_still_axis(s) < 0) || !(goal->eta > 0) ||
        nt->escapes == CLOTHI_ESCAPES || !clothi_compressed(s))
        return CLOTH_OK;
    nt->escapes++;
    status = clothi_newton_assemble(s, goal, 1);
    if (!status)
        status = clothi_noise(s, 1e-3 * radius / (goal->eta * goal->eta), 1e-4, radius);
    if (status || !s->linear.hit || !clothi_escape(s, goal, CLOTHI_ESCAPE * s->edge, nt->value))
        return status;
    nt->size = nt->radius = CLOTHI_ESCAPE * s->edge;
    nt->refused = nt->done = 0, nt->was = NULL;
    status = clothi_objective(s, goal, s->w.x, s->w.grad, 0, 0, &nt->value);
    if (!status) status = clothi_newton_renew(s, goal, nt);
    clothi_newton_rhs(s);
    return status;
}

/* J, phi's potential from term i on but for contact and attachments, whose targets have moved:
 * where the last value was taken, or of `goal` at x^n. */
static cloth_status clothi_potential(cloth_sim *s, clothi_goal *goal, int i, double *sum) {
    cloth_status status = CLOTH_OK;
    if (goal) s->fresh = 0, goal->e.x = s->state.x, goal->e.grad = NULL, goal->e.hess = NULL;
    for (*sum = 0; i < s->nterms && !status; i++) {
        if (goal) status = s->term[i].eval(s->term[i].user, &goal->e, &s->term_energy[i]);
        *sum += i == CLOTHI_TERM_ATTACH ? 0 : s->term_energy[i];
    }
    return status;
}

/* Whether iteration `it` is the last, done or not; before: phi before it. With contact: from J, the
 * potential at x^n, on. What zones have strained on the way to the search's start is energy that
 * the step makes as well. */
static cloth_status clothi_capped(cloth_sim *s, clothi_goal *goal, int it, double before,
                                  double value, double *from, int *last) {
    cloth_status status = CLOTH_OK;
    double       kinetic = 0, gain;
    int          i;
    *last = it >= CLOTHI_NEWTON_CAP;
    if (!s->contact_on || it < CLOTHI_CONTACT_CAP || *last) return CLOTH_OK;
    (void)clothi_potential(s, NULL, 0, &gain);
    if (it == CLOTHI_CONTACT_CAP) status = clothi_potential(s, goal, 0, from);
    gain -= *from;
    for (i = 0; i < 3 * s->model->nv; i++) {
        const double v = s->state.v[i], u = (s->w.x[i] - s->state.x[i]) / s->in.h;
        kinetic += 0.5 * s->params.mass[i / 3] * v * v;
        gain += 0.5 * s->params.mass[i / 3] * (u * u - v * v);
    }
    *last = !(gain > 0 && before - value > CLOTHI_FALLS * kinetic);
    return status;
}

/* Moves w.x to a minimum of phi. On CLOTH_OK the report's outcome says how it ended. With contact
 * every iterate is feasible and may be accepted. */
static cloth_status clothi_minimise(cloth_sim *s, clothi_goal *goal) {
    const cloth_desc *d = &s->model->desc;
    const double      eta = clothi_max(goal->eta, CLOTHI_REST_TIME);
    const int         most = s->calm == CLOTHI_RETAKES ? 0 :
                             (int)clothi_min(d->max_newton, CLOTHI_NEWTON_CAP) << s->calm;
    clothi_newton     nt;
    cloth_status      status = CLOTH_OK;
    double            from = 0, before;
    int               it, last = 0;
    memset(&nt, 0, sizeof nt);
    nt.size = HUGE_VAL;
    if (s->contact_on) {
        double *was = clothi_charge(s, &s->ms.contact);
        status = s->contact.update(s->contact.user, s->w.x, NULL, NULL);
        (void)clothi_charge(s, was);
    }
    if (!status) status = clothi_objective(s, goal, s->w.x, s->w.grad, 0, 0, &nt.value);
    if (!status) status = clothi_check_terms(s, nt.value);
    if (status) return status;
    clothi_newton_rhs(s);
    s->fresh = 1;
    if (eta * eta * clothi_newton_pull(s) <= CLOTHI_REST * d->tolerance) return CLOTH_OK;
    for (it = 1; !nt.done; it++) {
        before = nt.value;
        nt.exact = nt.size <= clothi_max(CLOTHI_EXACT * s->edge, d->tolerance) ||
                   (it > CLOTHI_LATE && nt.size <= CLOTHI_EXACT_LATE * s->edge);
        nt.exact &= clothi_exact_asked(s);
        if (nt.stuck >= CLOTHI_STUCK) nt.exact = 0, nt.stuck = -1;
        status = clothi_newton_iterate(s, goal, &nt);
        if (status == CLOTH_ERR_STEP && nt.exact) {     /* no decrease: once more, definite */
            nt.refused = 1;
            nt.size = HUGE_VAL;
            status = CLOTH_OK;
        }
        if (!status && nt.done) status = clothi_off_saddle(s, goal, &nt);
        if (!status && !nt.done)
            status = clothi_capped(s, goal, it, before, nt.value, &from, &last);
        if (!status && last) status = CLOTH_ERR_STEP;
        if (status == CLOTH_ERR_STEP && !s->contact_on) return clothi_stalled(s, "step");
        if (status && status != CLOTH_ERR_STEP) return status;
        if (status || s->finish || (!nt.done && most > 0 && it >= most)) {
            s->report.outcome = CLOTH_STEP_MAX_ITERATIONS;
            return CLOTH_OK;
        }
    }
    return CLOTH_OK;
}

/* ===== [9.3] IMPLICIT STEPS AND STATICS ======================================================
 *
 *   Euler   y = x^n + h v^n                                    eta = h      v = (x - x^n)/h
 *   BDF2    y = (4 x^n - x^(n-1))/3 + 2h/9 (4 v^n - v^(n-1))   eta = 2h/3
 *           v = (3 x - 4 x^n + x^(n-1))/(2h)
 *
 * Both come from the same equation. With v' = M^-1 f(x), x' = v, BDF2 reads
 *   3/2 x - 2 x^n + 1/2 x^(n-1) = h v,     3/2 v - 2 v^n + 1/2 v^(n-1) = h M^-1 f(x)
 * and putting v of the first, v = (3 x - 4 x^n + x^(n-1))/(2h), into the second, times 2h/3:
 *   (3 x - 4 x^n + x^(n-1))/2 - 2h/3 (2 v^n - 1/2 v^(n-1)) = 2h^2/3 M^-1 f(x)
 *   x - (4 x^n - x^(n-1))/3 - 2h/9 (4 v^n - v^(n-1))       = (2h/3)^2 M^-1 f(x)
 * that is M (x - y)/eta^2 = f(x) with the y and eta above: the gradient of 1/(2 eta^2) |x - y|_M^2
 * + E_pot. Gravity is a term of E_pot.
 *
 * What a step does to a mode. x'' = -omega^2 x turns z = omega x + i v: z' = -i omega z. With w =
 * h omega implicit Euler takes z to z/(1 + i w): the energy |z|^2/2 falls by 1/(1 + w^2), the phase
 * moves by atan w instead of w: order 1. BDF2: z_n = e^(n s) needs 3/2 - 2 e^-s + 1/2 e^-2s = -i w.
 * The left side is s - s^3/3 + s^4/4 - ..., so s = -i w + i w^3/3 - w^4/4 + ...: the phase is wrong
 * by w^2/3 of itself, order 2, and the energy falls by w^4/2. At w = 0.1: 1 % a step against
 * 0.005 %; fast modes (w >> 1) are gone at once under both, which is why any h is stable.
 *
 * BDF2 needs two equal steps behind it. Its history is dropped by create, a write to the state or
 * the params, another h, and any step with an active contact row (a position projection under BDF2
 * rebounds); the next substep is then one of implicit Euler. A search that stops early (max_newton,
 * a loose tolerance) leaves what the next prediction enlarges. The ledger shows such a step, and
 * one of motion that h hardly resolves, and it is taken again: clothi_booked() [9.5].
 *
 * Statics: eta infinite. H may be singular (a free cloth) or indefinite (compression), so the
 * solve is (H + sigma M) dx = -g with sigma falling tenfold on success and rising on failure:
 * for large sigma a small step down the gradient, for sigma = 0 Newton. What it ends on is
 * checked: the exact H is factored, and a negative pivot gives a direction down the saddle,
 * along which the search goes on. Wind follows the faces, so it has no potential: it is taken at
 * the last equilibrium, and solve and wind are repeated until both agree. Where they do not, as
 * with little friction along the faces (the default lift), there is no calm state to be found: a
 * run in time flaps there for ever, and the call says CLOTH_STEP_STALLED.
 * checked: tests/test_order.c (orders 1 and 2), tests/test_step.c (cut_short), tests/validate/
 */

/* Where unknown i would go without forces. */
static double clothi_predicted(const cloth_sim *s, double h, int bdf2, int i) {
    const double *x = s->state.x, *v = s->state.v;
    return bdf2 ? (4 * x[i] - s->x_prev[i]) / 3 + 2 * h / 9 * (4 * v[i] - s->v_prev[i])
                : x[i] + h * v[i];
}

/* Fills w.y and eta for a substep of h; returns whether BDF2's history was used. */
static int clothi_predict(cloth_sim *s, double h, double *eta) {
    int i, n = 3 * s->model->nv;
    int bdf2 = s->model->desc.integrator == CLOTH_INTEGRATOR_BDF2 && s->history && !s->calm &&
               fabs(h - s->h_prev) <= 1e-9 * h;         /* t + h - t of late t is h */
    *eta = bdf2 ? 2 * h / 3 : h;
    for (i = 0; i < n; i++) s->w.y[i] = clothi_predicted(s, h, bdf2, i);
    return bdf2;
}

/* New velocity from w.x, then history and state move on. */
static void clothi_advance(cloth_sim *s, double h, int bdf2, int keep_history) {
    double *x = s->state.x, *v = s->state.v;
    int     i, n = 3 * s->model->nv;
    for (i = 0; i < n; i++) {
        double x_new = s->w.x[i];
        double v_new = bdf2 && keep_history
                           ? (3 * x_new - 4 * x[i] + s->x_prev[i]) / (2 * h)
                           : (x_new - x[i]) / h;
        if (s->x_prev) s->x_prev[i] = keep_history ? x[i] : 0;
        s->v_prev[i] = keep_history ? v[i] : 0;
        x[i] = x_new;
        v[i] = v_new;
    }
    s->history = keep_history, s->h_prev = h;
    s->state.t += h;
}

/* The input of a substep of h from the state on, between these shares of what the step goes. */
static void clothi_input(cloth_sim *s, double h, double start, double end) {
    cloth_step_input *in = &s->in;
    memset(in, 0, sizeof *in);
    in->h = h, in->t = s->state.t, in->x = s->state.x, in->v = s->state.v;
    in->share[0] = s->fraction * start, in->share[1] = s->fraction * end;
    if (s->history) in->x_prev = s->x_prev, in->v_prev = s->v_prev;
    in->h_prev = s->h_prev, in->pin = s->pin, in->goal = s->target;
    memcpy(in->gravity, s->gravity, sizeof in->gravity);
    if (s->force_on) in->force = s->force;
    in->wind_on = s->wind_on;
    memcpy(in->wind, s->wind, sizeof in->wind);
    if (s->nattach > 0) in->nattach = s->model->desc.max_attachments;
    in->attach = s->attach;
}

CLOTHI_OUTLINE static cloth_eval clothi_eval_of(const cloth_sim *s) {
    cloth_eval e;
    memset(&e, 0, sizeof e);
    e.model = s->model, e.params = &s->params, e.in = &s->in, e.nv = s->model->nv;
    return e;
}

/* Pin goals of this substep, its end's share of the way from the step's start to the targets; what
 * the solver must not move, pins and followers of ties; and a starting guess that obeys both. */
static void clothi_guess(cloth_sim *s, double h) {
    const cloth_model *m = s->model;
    const int          calm = s->calm && s->calm < CLOTHI_RETAKES && !s->contact_on;
    const int          old = s->history && !s->calm;
    int                i, n = 3 * m->nv;
    memcpy(s->fixed, s->pin, (size_t)m->nv);
    for (i = 0; i < n; i++) {
        s->w.x[i] = s->state.x[i] + h * (calm ? s->frame[i % 3] :
                                         old ? 1.5 * s->state.v[i] - 0.5 * s->v_prev[i]
                                             : s->state.v[i]);
        if (s->pin[i / 3] >> (i % 3) & 1)
            s->w.x[i] = s->w.y[i] = s->w.x0[i] + s->in.share[1] * (s->target[i] - s->w.x0[i]);
    }
    for (i = 0; m->tie && i < n; i++)
        if (m->tie[i] >= 0) s->fixed[i / 3] = (unsigned char)(s->fixed[i / 3] | 1u << (i % 3));
    clothi_tie_place(m, s->w.x);
    s->in.goal = s->w.y;
}

static void clothi_eval_start(cloth_sim *s, clothi_goal *goal, double h) {
    memset(goal, 0, sizeof *goal);
    goal->e = clothi_eval_of(s), goal->e.h = h, goal->e.t = s->state.t + h;
    goal->e.x_n = s->state.x, goal->e.v_n = s->state.v;
}

/* Terms i .. end - 1 alone. */
static cloth_status clothi_terms_some(cloth_sim *s, const cloth_eval *e, int i, int end) {
    cloth_status status = CLOTH_OK;
    for (; i < end && !status; i++)
        if (s->term[i].begin) status = s->term[i].begin(s->term[i].user, e);
    return status;
}

static cloth_status clothi_terms_begin(cloth_sim *s, const clothi_goal *goal) {
    cloth_status status = clothi_terms_some(s, &goal->e, 0, s->nterms);
    if (!status && s->contact_on) {
        double *was = clothi_charge(s, &s->ms.contact);
        s->own.counts.contact_calls++;
        status = s->contact.begin(s->contact.user, &goal->e);
        (void)clothi_charge(s, was);
    }
    return status;
}

/* --- ledger --- */

/* Energies of the last evaluation into the ledger. */
static void clothi_ledger_terms(const cloth_sim *s, cloth_ledger *l) {
    int i;
    l->stretch = s->term_energy[CLOTHI_TERM_MEMBRANE] - s->own.membrane.loss;
    l->bend = s->term_energy[CLOTHI_TERM_BEND] - s->own.bend.loss;
    l->gravity = s->term_energy[CLOTHI_TERM_GRAVITY];
    l->attach = s->term_energy[CLOTHI_TERM_ATTACH];
    l->other = 0;
    for (i = s->nbuiltin; i < s->nterms; i++) l->other += s->term_energy[i];
}

/* Of velocities v [nv x 3], seen from what moves at frame [3]; what is pinned counts too. */
static double clothi_kinetic(const cloth_sim *s, const double *v, const double *frame) {
    double d[3], sum = 0;
    int    i;
    for (i = 0; i < s->model->nv; i++) {
        clothi_sub3(v + 3 * i, frame, d);
        sum += 0.5 * s->params.mass[i] * clothi_dot3(d, d);
    }
    return sum;
}

static void clothi_ledger_total(const cloth_sim *s, const double *v, cloth_ledger *l) {
    static const double rest[3] = {0, 0, 0};
    l->kinetic = clothi_kinetic(s, v, rest);
    l->total = l->kinetic + l->stretch + l->bend + l->gravity + l->attach + l->other;
}

/* Energies at x, v without inertia; gradient into w.grad when asked. */
CLOTHI_OUTLINE static cloth_status clothi_energy_at(cloth_sim *s, const double *x, const double *v,
                                                    int grad, cloth_ledger *l) {
    clothi_goal  goal;
    cloth_status status;
    double       value;
    clothi_eval_start(s, &goal, 0);
    goal.e.x_n = x, goal.e.v_n = v;
    status = clothi_terms_some(s, &goal.e, s->nbuiltin, s->nterms);
    if (!status) status = clothi_objective(s, &goal, x, grad ? s->w.grad : NULL, 0, 0, &value);
    if (status) return status;
    clothi_ledger_terms(s, l);
    clothi_ledger_total(s, v, l);
    return status;
}

/* Work of the attachments' hands while their targets move by `part` of the step, forces at x. */
static double clothi_attach_work(const cloth_sim *s, const double *x, double part) {
    double r[3], w[6], sum = 0;
    int    i, k, v[6];
    for (i = 0; i < s->in.nattach; i++) {
        const cloth_step_attachment *q = s->in.attach + i;
        if (!clothi_attach_gap(s->model, &s->in, q, x, v, w, r)) continue;
        for (k = 0; k < 3; k++) sum -= q->k * r[k] * part * (q->target[k] - q->pose[k]);
    }
    return sum;
}

/* Work and losses of an implicit substep, from the gradient at its minimiser w.x: what is left of
 * it on a pinned axis, with the inertia of what is pinned, is the force that the support gives. */
static cloth_status clothi_balance(cloth_sim *s, clothi_goal *goal) {
    const double  w = goal->eta > 0 ? 1 / (goal->eta * goal->eta) : 0;
    cloth_ledger *l = &s->report.energy;
    double        value, big = 0;
    cloth_status  status = CLOTH_OK;
    int           i, n = 3 * s->model->nv, capped = s->model->desc.max_newton > 0;
    if (!s->fresh) status = clothi_objective(s, goal, s->w.x, s->w.grad, 0, 0, &value);
    if (status) return status;
    s->fresh = 1;
    goal->e.x = s->w.x;
    l->damping_loss += 2 * (s->own.membrane.loss + s->own.bend.loss);
    memcpy(s->w.rhs, s->w.grad, (size_t)n * sizeof(double));
    clothi_tie_gradient(s->model, s->w.rhs);
    for (i = 0; i < n; i++) {
        const double dx = s->w.x[i] - s->state.x[i], f = s->w.rhs[i];
        const int    pinned = s->pin[i / 3] >> (i % 3) & 1;
        double       inertia;
        if (s->force_on) l->force_work += s->force[i] * dx;
        if (!pinned && !capped) continue;
        inertia = w * s->params.mass[i / 3] *
                  (s->w.x[i] - clothi_predicted(s, goal->e.h, goal->eta < goal->e.h, i));
        if (pinned) l->pin_work += (f + inertia) * dx;
        s->pushed[0][i % 3] += goal->e.h * (pinned ? inertia : inertia - f);
        if (s->contact_on) s->pushed[1][i % 3] -= goal->e.h * (s->w.grad[i] - s->w.free[i]);
    }
    if (s->contact_on && s->contact.balance) s->contact.balance(s->contact.user, l);
    l->pin_work += clothi_attach_work(s, s->w.x, s->in.share[1] - s->in.share[0]);
    for (i = 0; i < n; i++)
        if (!(s->fixed[i / 3] >> (i % 3) & 1) && fabs(s->w.rhs[i]) > big) big = fabs(s->w.rhs[i]);
    s->report.residual_N = big;
    if (s->wind_on) {
        double *wind = s->w.trial;
        memset(wind, 0, (size_t)n * sizeof(double));
        goal->e.grad = wind, goal->e.hess = NULL;
        status = s->term[CLOTHI_TERM_WIND].eval(&s->own, &goal->e, &value);
        for (i = 0; i < n; i++) l->wind_work -= wind[i] * (s->w.x[i] - s->state.x[i]);
    }
    return status;
}

/* --- a substep --- */

/* Of two feasible points, w.x and w.trial, the one with the smaller objective into w.x: a
 * projection may have strained what had no time to give. */
static cloth_status clothi_better_start(cloth_sim *s, clothi_goal *goal) {
    const size_t bytes = 3 * (size_t)s->model->nv * sizeof(double);
    cloth_status status = CLOTH_OK;
    double       value[2] = {0, 0};
    int          i;
    if (memcmp(s->w.x, s->w.trial, bytes) == 0) return CLOTH_OK;
    for (i = 0; i < 2 && !status; i++) {
        const double *x = i ? s->w.trial : s->w.x;
        status = s->contact.update(s->contact.user, x, NULL, NULL);
        if (!status) status = clothi_objective(s, goal, x, NULL, 0, 0, value + i);
    }
    if (!status && !(value[0] <= value[1])) memcpy(s->w.x, s->w.trial, bytes);
    return status;
}

/* Contact takes the guess in w.x to a feasible point, from which every move is cut; what was
 * minimised is closed. Where the way to the feasible point was an impact the substep is one of
 * implicit Euler. */
static cloth_status clothi_contact_start(cloth_sim *s, clothi_goal *goal, int *bdf2, int *impact) {
    double      *was = clothi_charge(s, &s->ms.contact);
    cloth_status status;
    int          i;
    s->own.counts.contact_calls++;
    status = s->contact.start(s->contact.user, &goal->e, s->w.x, s->w.trial, impact);
    if (*impact && *bdf2) {
        for (i = 0; i < 3 * s->model->nv; i++)
            if (!(s->pin[i / 3] >> (i % 3) & 1))        /* followers of ties have inertia too */
                s->w.y[i] = clothi_predicted(s, goal->e.h, 0, i);
        s->in.eta = goal->eta = goal->e.h;
        *bdf2 = 0;
        s->report.restarts++;
    }
    if (!status) status = clothi_better_start(s, goal);
    (void)clothi_charge(s, was);
    return status ? status : clothi_check_vertices(s, "step: x", s->w.x);
}

static void clothi_recorded(const cloth_sim *s, const double *x) {
    if (s->recorder.substep) s->recorder.substep(s->recorder.user, &s->in, x);
}

static cloth_status clothi_substep_implicit(cloth_sim *s) {
    const double h = s->in.h;
    clothi_goal  goal;
    cloth_status status;
    double       before = 0, after;
    int          bdf2, impact = 0;
    clothi_eval_start(s, &goal, h);
    bdf2 = clothi_predict(s, h, &goal.eta);
    s->in.eta = goal.eta, s->in.y = s->w.y;
    if (s->model->desc.integrator == CLOTH_INTEGRATOR_BDF2 && !bdf2) s->report.restarts++;
    clothi_guess(s, h);
    status = clothi_terms_begin(s, &goal);
    if (!status && s->balance) status = clothi_potential(s, &goal, s->nbuiltin, &before);
    if (!status && s->contact_on)
        status = clothi_contact_start(s, &goal, &bdf2, &impact);
    if (status == CLOTH_ERR_STEP) s->report.outcome = CLOTH_STEP_COLLISION_FAILED;
    if (!status) status = clothi_minimise(s, &goal);
    if (!status) status = clothi_check_vertices(s, "step: x", s->w.x);
    if (!status && s->contact_on) {
        double *was = clothi_charge(s, &s->ms.contact);
        status = s->contact.close(s->contact.user, s->w.x, &impact);
        (void)clothi_charge(s, was);
        s->fresh = 0;
    }
    if (!status && s->balance) status = clothi_balance(s, &goal);
    if (status) return status;
    (void)clothi_potential(s, NULL, s->nbuiltin, &after);
    s->hosted += after - before;
    clothi_recorded(s, s->w.x);
    clothi_advance(s, h, bdf2, !impact && !s->calm);
    s->report.substeps++;
    return CLOTH_OK;
}

#define CLOTHI_STATIC_CAP   4000            /* iterations and rounds before it has stalled     */
#define CLOTHI_STATIC_FAR    1e9            /* mean edges: only negative curvature leads there */
/* --- statics --- */

/* Longest side of the box around x [nv x 3]. */
static double clothi_extent(const double *x, int nv) {
    double size = 0;
    int    i, k;
    for (k = 0; k < 3; k++) {
        double low = x[k], high = x[k];
        for (i = 0; i < nv; i++) {
            low = clothi_min(low, x[3 * i + k]);
            high = clothi_max(high, x[3 * i + k]);
        }
        size = clothi_max(size, high - low);
    }
    return size;
}

/* At a converged point: a direction of negative curvature of the exact Hessian into w.dx; *saddle
 * 0: there is none. A factor has no blocks outside the pattern: with some, noise finds one. */
static cloth_status clothi_static_curvature(cloth_sim *s, clothi_goal *goal, int *saddle) {
    cloth_status status;
    *saddle = 0;
    goal->sigma = 0;
    status = clothi_newton_assemble(s, goal, 1);
    if (!status && s->matrix->ne > 0) {
        status = clothi_noise(s, 1, 1e-10, CLOTHI_STATIC_FAR * s->edge);
        *saddle = s->linear.hit;
    } else if (!status) {
        status = clothi_solver_factor(s->solver, s->matrix, s->fixed);
        status = status == CLOTH_ERR_NUMERIC ? CLOTH_OK : status;
        *saddle = cloth_factor_direction(s->solver->factor, s->w.dx) < 0;
        clothi_tie_spread(s->model, s->w.dx);
        s->report.factorizations++;
        s->report.negative += *saddle;
    }
    if (!status && *saddle) *saddle = clothi_max_abs(s->w.dx, 3 * s->model->nv) > 0;
    return status;
}

/* Newton with a diagonal sigma M that falls from ten times the largest gravity mode, g over the
 * extent, 1/s^2, to zero, or to the least value at which H is not singular to rounding (a free
 * cloth), and there the last update counts. */
static cloth_status clothi_static_newton(cloth_sim *s, clothi_goal *goal) {
    const cloth_desc *d = &s->model->desc;
    const double  size = clothi_extent(s->state.x, s->model->nv);
    const double  g = sqrt(clothi_dot3(s->in.gravity, s->in.gravity));
    const double  sigma0 = (g > 0 ? g : 1) / (size > 0 ? size : 1) * 10;
    double        sigma = sigma0, least = 0, a;
    clothi_newton nt;
    cloth_status  status;
    int           it, cap = d->max_newton > 0 ? d->max_newton : CLOTHI_STATIC_CAP;
    memset(&nt, 0, sizeof nt);
    status = clothi_objective(s, goal, s->w.x, s->w.grad, 0, 0, &nt.value);
    clothi_newton_rhs(s);
    for (it = 1; !status; it++) {
        status = clothi_cancelled(&s->hooks, &s->finish);
        goal->sigma = sigma;
        nt.exact = 1;                       /* and negative: singular to rounding even so */
        if (!status) status = clothi_newton_system(s, goal, &nt, 1e-10, CLOTH_LINEAR_CHOLESKY);
        if (status) break;
        a = 1;
        if (!s->linear.negative) status = clothi_line_search(s, goal, &nt, &a);
        if (s->linear.negative || status == CLOTH_ERR_STEP) {
            if (s->linear.negative && sigma <= least)
                least = least > 0 ? 10 * least : 1e-6 * sigma0;
            sigma = sigma > 0 ? 10 * sigma : 1e-6 * sigma0;
            status = sigma > 1e12 * sigma0 ? CLOTH_ERR_STEP : CLOTH_OK;
            continue;
        }
        if (status) break;
        memcpy(s->w.x, s->w.trial, 3 * (size_t)s->model->nv * sizeof(double));
        clothi_newton_rhs(s);
        s->report.residual_m = a * nt.size;
        if (nt.size < d->tolerance) {
            if (sigma <= least) return CLOTH_OK;
            sigma = least;
        } else if (a >= 1)
            sigma = 0.2 * sigma > least && sigma > 1e-7 * sigma0 ? 0.2 * sigma : least;
        else if (a < 0.25)
            sigma = sigma > 0 ? 4 * sigma : 1e-6 * sigma0;
        if (it >= cap || s->finish) {
            s->report.outcome = CLOTH_STEP_MAX_ITERATIONS;
            if (d->max_newton > 0 || s->finish) return CLOTH_OK;
            status = CLOTH_ERR_STEP;
        }
    }
    return status == CLOTH_ERR_STEP ? clothi_stalled(s, "static") : status;
}

/* Terms take forces from x^n, which is to be x itself: wind, maybe a host's. */
static int clothi_static_lags(const cloth_sim *s) { return s->wind_on || s->nterms > s->nbuiltin; }

/* Moved along an axis on which nothing is held the cloth keeps its shape: what pulls there finds no
 * rest, and the search would end far out. */
static cloth_status clothi_static_held(cloth_sim *s) {
    double net[3] = {0, 0, 0}, all = 0, f;
    int    i, held = s->nattach || s->contact_on || clothi_static_lags(s) ? CLOTH_AXIS_ALL : 0;
    for (i = 0; i < 3 * s->model->nv; i++) {
        f = s->params.mass[i / 3] * s->gravity[i % 3] + (s->force_on ? s->force[i] : 0);
        net[i % 3] += f, all += fabs(f), held |= s->pin[i / 3];
    }
    for (i = 0; i < 3; i++)
        if (!(held >> i & 1) && fabs(net[i]) > 1e-9 * all) {
            s->report.outcome = CLOTH_STEP_STALLED;
            return clothi_fail(&s->hooks, CLOTH_ERR_STEP, "statics: %g N along axis %i and nothing "
                               "is pinned or attached there", net[i], i);
        }
    return CLOTH_OK;
}

static cloth_status clothi_static_run(cloth_sim *s) {
    clothi_goal  goal;
    cloth_status status = clothi_static_held(s);
    int          i, round, n = 3 * s->model->nv, saddle = 1, lags = clothi_static_lags(s);
    if (status) return status;
    s->report.outcome = CLOTH_STEP_CONVERGED;
    memset(s->state.v, 0, (size_t)n * sizeof(double));
    clothi_eval_start(s, &goal, 0);
    memcpy(s->w.y, s->state.x, (size_t)n * sizeof(double));
    clothi_input(s, 0, 0, 1);
    clothi_guess(s, 0);
    for (round = 0; round + s->report.newton < CLOTHI_STATIC_CAP && saddle && !status; round++) {
        double relax = lags && round > 1 ? 0.5 : 1;         /* or the cloth flaps for ever */
        for (i = 0; i < n; i++) s->state.x[i] += relax * (s->w.x[i] - s->state.x[i]);
        status = clothi_terms_begin(s, &goal);          /* they lag to where we are */
        if (!status) status = clothi_static_newton(s, &goal);
        if (status || s->report.outcome != CLOTH_STEP_CONVERGED) break;
        status = clothi_static_curvature(s, &goal, &saddle);
        if (!status && saddle) {
            double value;
            status = clothi_objective(s, &goal, s->w.x, NULL, 0, 0, &value);
            if (!status) saddle = clothi_escape(s, &goal, CLOTHI_ESCAPE * s->edge, value);
        }
        for (i = 0; lags && i < n && !saddle; i++)
            saddle = fabs(s->w.x[i] - s->state.x[i]) > s->model->desc.tolerance;
    }
    memcpy(s->state.x, s->w.x0, (size_t)n * sizeof(double));
    if (!status && saddle && s->report.outcome == CLOTH_STEP_CONVERGED)
        status = clothi_stalled(s, lags ? "static: wind, or a host's force, and shape do not agree"
                                        : "static");
    if (status) return status;
    if (s->balance) status = clothi_balance(s, &goal);
    clothi_recorded(s, s->w.x);
    memcpy(s->state.x, s->w.x, (size_t)n * sizeof(double));
    clothi_forget(s);
    return status;
}

CLOTHI_RARE_END

/* ===== [9.4] LEAPFROG ========================================================================
 *
 *   kick   v <- v + h_s/2 a(x)        a(x) = M^-1 ( -dE/dx )
 *   drift  x <- x + h_s v
 *   kick   v <- v + h_s/2 a(x)        x and v at one time; order 2; time-reversible
 *
 * Two kicks in a row are one, so a substep costs one force evaluation and no matrix at all.
 *
 * Why there is a limit. Two drifts with the kick between them give x(n+1) - 2 x(n) + x(n-1) =
 * h_s^2 a(x(n)). For a mode, a = -omega^2 x, try x(n) = e^(i n p): 2 cos p - 2 = -w^2, w = h_s
 * omega, that is sin(p/2) = w/2. Up to w = 2 the phase p is real: the mode swings for ever, no
 * energy lost, with p = 2 asin(w/2) = w + w^3/24 + ... instead of w: order 2. Beyond w = 2 no
 * real p exists, and of the two solutions, whose product is 1, one grows without bound. M^-1 K
 * has real modes only, so the fastest decides: h_s < 2/omega_max, omega_max^2 the largest
 * eigenvalue of M^-1 K. A chain of springs k and masses m has omega_max = 2 sqrt(k/m), its
 * neighbours in opposition: each k is stretched by twice the amplitude. We find omega_max by
 * the power method on M^-1 K, each element at rest in its template's plane: a function of model and
 * params alone, made once. Stretched elements are stiffer: along a principal stretch s the tangent
 * of StVK grows like (3 s^2 - 1)/2; a spring of length l gains k (1 - L/l) across itself, springs
 * all round at most 2 - L/l in all; below L/2 it pushes more across than along, by k (L/l - 1);
 * a hinge's grows like 1/h^2 as its wings are pressed. So each step scales omega^2 by that at its
 * start, triangles by the largest mean around a vertex (a mode at the grid's scale lives on a ring
 * of them), hinges by their largest row sum where bending counts, keeps CLOTHI_LEAP_SAFETY in hand,
 * and is taken again with twice the substeps as soon as the cloth is strained beyond that. What is
 * pressed is stiff for a substep or two: its growth counts CLOTHI_LEAP_PRESSED times, and from that
 * on no substep goes by unseen.
 *
 * Leapfrog keeps its energy while its substep stays the same and is not close to the limit. At w =
 * sqrt(3), p = 2 pi/3, each third substep finds a mode as it was, and what is cubic in the energy
 * feeds it. Below no three modes add up to p = 2 pi: CLOTHI_LEAP_SAFETY is less than sqrt(3)/2. A
 * substep that changes with every frame heats too. So a step takes CLOTHI_LEAP_RESERVE substeps
 * more than it must, or twice as many, and keeps the substep of the step before, which is part of
 * the state, or the nearest one of up to half as many again.
 *
 * What takes off speeds at the rate r bounds h_s too: 2 r h_s + (h_s omega)^2 <= 4.
 *   damping  adds tau K to the dashpots: r = tau omega^2
 *   wind     F = -c |u| u is explicit too: r = 2 c |u|/m
 *
 * Forces: undamped triangles with bending take the path of [6.5] "stretch and bending in one".
 * What was tried for it and for the reserve of a substep, and what lost: bench_explicit.c.
 *
 * Contact looks at every substep: the drift x(n) -> x(n+1) is brought to the nearest feasible point
 * and v(n+1/2) made to approach nothing that it met there, a projection on a cone, which takes
 * kinetic energy and gives none (obstacles at rest). Looked at over several drifts at once, what
 * had gone far through is brought back against the cloth's own stretch: bench_explicit.c.
 *
 * Cost: nf + nh element forces a substep, and all of contact's detection; omega ~
 * sqrt(Y/rho)/edge, so a second costs ~ 1/edge^3.
 *
 * Ledger, when a report is wanted: a kick by a force F does the work kick F.(v + v')/2 on the
 * velocities before and after it, exactly; wind and pins are counted so, attachments by how far
 * their targets move, damping by twice its potential in each substep (order 1).
 *
 * checked: tests/test_leapfrog.c (stability_limit, energy_bounded, shivers, unrolled)
 */

#define CLOTHI_LEAP_SAFETY  0.8             /* of the stability limit                          */
#define CLOTHI_LEAP_RESERVE 1.5             /* substeps more than are safe                     */
#define CLOTHI_LEAP_MARGIN  1.02            /* for the power method's shortfall                 */
#define CLOTHI_LEAP_BENDS   0.25            /* of omega^2 in bending's bound: it is looked at  */
#define CLOTHI_LEAP_POWER   60              /* power iterations, once per set of params        */
#define CLOTHI_LEAP_WATCH   4               /* substeps between looks at the stretch           */
#define CLOTHI_LEAP_PRESSED 4               /* times growth: it changes within a substep       */
#define CLOTHI_LEAP_RETRIES 6               /* doublings of the substeps within one step       */

typedef struct clothi_leap {
    cloth_sim    *s;
    const double *extra;                    /* gradient of the other terms, or NULL            */
    const int    *stop;                     /* [nv] where a vertex's gather entries end        */
    double        kick, drift;              /* s                                               */
    double        alpha;                    /* where the pins are at the end of the drift      */
    cloth_ledger *ledger;                   /* of a report that is wanted, or NULL             */
    double        wind;                     /* W, minus the wind's power before the kick       */
} clothi_leap;

/* Forces of the vertices [begin, end), kick, drift; what is pinned goes its straight path. */
static void clothi_leap_range(int begin, int end, int worker, void *ctx) {
    const clothi_leap *p = (const clothi_leap *)ctx;
    const cloth_sim   *s = p->s;
    const cloth_model *m = s->model;
    double *CLOTHI_RESTRICT x = s->w.x, *CLOTHI_RESTRICT v = s->w.trial, *f = s->w.dx;
    const double       kick = p->kick, drift = p->drift, *g = s->in.gravity;
    int                i, j, k;
    (void)worker;
    clothi_sum_corners(s->own.force, m->gather_start, p->stop, m->gather, begin, end, 1.0, f);
    for (k = 3 * begin; p->extra && k < 3 * end; k++) f[k] += p->extra[k];
    for (i = begin, k = 3 * i; i < end; i++) {
        const double w = kick * s->w.inv_mass[i];
        for (j = 0; j < 3; j++, k++) {
            v[k] += kick * g[j] - w * f[k];
            x[k] += drift * v[k];
            if (!(s->pin[i] >> j & 1)) continue;
            v[k] = s->w.y[k];
            x[k] = s->w.x0[k] + p->alpha * (s->target[k] - s->w.x0[k]);
        }
    }
}

/* Bending by triangles: see [6.5]. With damping, elements keep their own forces. */
static int clothi_leap_winged(const cloth_sim *s) {
    return s->model->wing && !(s->own.tau > 0);
}

static void clothi_leap_pulls(int begin, int end, int worker, void *ctx) {
    cloth_sim          *s = (cloth_sim *)ctx;
    const clothi_group *g = &s->model->bend;
    double              x[12 * CLOTHI_LANES], *pull = s->own.force + g->force;
    int                 b;
    (void)worker;
    for (b = begin; b < end; b++) {
        clothi_gather_lanes(s->w.x, g->vert + (size_t)b * 4 * CLOTHI_LANES, 4, x);
        if (g->kind == CLOTHI_HINGE)
            clothi_hinge_pulls(x, s->own.bend.rest + (size_t)b * 2 * CLOTHI_LANES,
                               pull + (size_t)b * CLOTHI_LANES);
        else
            clothi_quadratic_pulls(x, s->own.bend.rest + (size_t)b * 5 * CLOTHI_LANES,
                                   pull + (size_t)b * 3 * CLOTHI_LANES);
    }
}

static void clothi_leap_triangles(int begin, int end, int worker, void *ctx) {
    cloth_sim          *s = (cloth_sim *)ctx;
    const clothi_group *g = &s->model->membrane;
    const double       *all = s->own.force + s->model->bend.force;
    double              x[9 * CLOTHI_LANES], pull[9 * CLOTHI_LANES];
    int                 b, i;
    (void)worker;
    for (b = begin; b < end; b++) {
        const double *rest = s->own.membrane.rest + (size_t)b * 7 * CLOTHI_LANES;
        const double *side = s->own.side + (size_t)b * 9 * CLOTHI_LANES;
        const int    *wing = s->model->wing + (size_t)b * 3 * CLOTHI_LANES;
        double       *f = s->own.force + g->force + (size_t)b * 9 * CLOTHI_LANES;
        clothi_gather_lanes(s->w.x, g->vert + (size_t)b * 3 * CLOTHI_LANES, 3, x);
        if (s->model->bend.kind == CLOTHI_QUADRATIC) {
            clothi_gather_lanes(all, wing, 3, pull);
            clothi_winged_quadratic(x, rest, pull, side, f);
        } else {
            for (i = 0; i < 3 * CLOTHI_LANES; i++) pull[i] = all[wing[i]];
            clothi_winged_hinge(x, side, pull, f);
        }
    }
}

/* The mean of the triangles' factors around each free vertex, weighted by what they add to its
 * diagonal entry of K, area (2 mu + lambda) |g|^2; their largest. factor [batches x 8]. */
static double clothi_leap_rings(const cloth_sim *s, const double *factor) {
    const clothi_group *g = &s->model->membrane;
    const int nv = s->model->nv;
    double   *sum = s->w.inv_mass + nv, *weight = sum + nv, big = 1;
    int       b, lane, k, i;
    memset(sum, 0, 2 * (size_t)nv * sizeof(double));
    for (b = 0; b < g->nbatch; b++)
        for (lane = 0; lane < CLOTHI_LANES; lane++) {
            const double *r = s->own.membrane.rest + (size_t)b * 7 * CLOTHI_LANES + lane;
            const double  stiff = r[4 * CLOTHI_LANES] *
                                 (2 * r[5 * CLOTHI_LANES] + r[6 * CLOTHI_LANES]);
            const double  gx[3] = {-r[0] - r[2 * CLOTHI_LANES], r[0], r[2 * CLOTHI_LANES]};
            const double  gy[3] = {-r[CLOTHI_LANES] - r[3 * CLOTHI_LANES], r[CLOTHI_LANES],
                                   r[3 * CLOTHI_LANES]};
            for (k = 0; k < 3; k++) {
                const int    v = g->vert[(b * 3 + k) * CLOTHI_LANES + lane];
                const double w = stiff * (gx[k] * gx[k] + gy[k] * gy[k]);
                sum[v] += w * factor[b * CLOTHI_LANES + lane];
                weight[v] += w;
            }
        }
    for (i = 0; i < nv; i++)
        if (s->pin[i] != CLOTH_AXIS_ALL && sum[i] > big * weight[i]) big = sum[i] / weight[i];
    return big;
}

/* The largest row sum of |M^-1 K| of hinges at x, 1/s^2: K = c grad theta grad theta^T + M d2theta,
 * M = c (theta - theta0), where the gradient by a corner is at most s = 1/h1 + 1/h2, by all 2 s, h
 * the heights of both wings; second derivatives are taken for as large as s^2. */
static double clothi_leap_bends(const cloth_sim *s, const double *x) {
    enum { L = CLOTHI_LANES };
    const clothi_group *g = &s->model->bend;
    double *sum = s->w.inv_mass + s->model->nv, corners[12 * L], pull[L], big = 0;
    int     b, k, i;
    memset(sum, 0, (size_t)s->model->nv * sizeof *sum);
    for (b = 0; b < g->nbatch && g->kind == CLOTHI_HINGE; b++) {
        const double *c = s->own.bend.rest + (size_t)b * 2 * L;
        clothi_gather_lanes(x, g->vert + (size_t)b * 4 * L, 4, corners);
        clothi_hinge_pulls(corners, c, pull);
        for (k = 0; k < L; k++) {
            const clothi_fold f = clothi_fold_at(corners, clothi_one, k);
            const double stiff = c[k] + sqrt(f.l2) * fabs(pull[k]);
            const double floor_q = CLOTHI_HINGE_FLOOR * f.l2 * f.l2 + CLOTHI_HINGE_TINY_Q;
            const double steep = sqrt(f.l2 / (clothi_vec_dot(f.n, f.n) + floor_q)) +
                                 sqrt(f.l2 / (clothi_vec_dot(f.m, f.m) + floor_q));
            for (i = 0; i < 4; i++)
                sum[g->vert[(b * 4 + i) * L + k]] += 2 * stiff * steep * steep;
        }
    }
    for (i = 0; i < s->model->nv; i++) big = clothi_max(big, sum[i] / s->params.mass[i]);
    return big;
}

/* The factor by which strain raises the largest eigenvalue over the rest shape's, at least 1. Of
 * stretch: the elements' largest when that is below `enough`, else of triangles the largest of the
 * vertices' means. Hinges add by how much their bound has grown. */
static double clothi_leap_tangent(const cloth_sim *s, const double *x, double enough) {
    enum { L = CLOTHI_LANES };
    const clothi_group *g = &s->model->membrane;
    double *factor = s->own.energy_batch, corners[9 * L], low[L], big = 1, bent = 0;
    int     b, k;
    if (s->omega_bend > 0)
        bent = CLOTHI_LEAP_PRESSED * clothi_max(0, clothi_leap_bends(s, x) - s->omega_bend) /
               (s->omega_rest * s->omega_rest);
    for (b = 0; b < g->nbatch; b++, factor += L) {
        const double *rest = s->own.membrane.rest +
                             (size_t)b * (size_t)s->own.membrane.kind->nrest * L;
        clothi_gather_lanes(x, g->vert + (size_t)(b * g->width) * L, g->width, corners);
        if (g->kind == CLOTHI_TRIANGLE) clothi_stretch_squares(corners, rest, low, factor);
        else clothi_spring_measure(corners, rest, factor);
        for (k = 0; k < L; k++) {
            const double part = rest[L + k] / (factor[k] + 1e-300);     /* of springs: L/l */
            const int   *v = g->vert + b * g->width * L + k,
                         held = (s->pin[v[0]] & s->pin[v[L]]) == CLOTH_AXIS_ALL;
            factor[k] = g->kind == CLOTHI_TRIANGLE ? 0.5 * (3 * factor[k] - 1) :
                        clothi_max(2 - part, held ? 1 : 1 + CLOTHI_LEAP_PRESSED * (part - 2));
            big = clothi_max(big, factor[k]);
            factor[k] = clothi_max(factor[k], 1);
        }
    }
    if (big + bent > enough && g->kind == CLOTHI_TRIANGLE)
        big = clothi_leap_rings(s, s->own.energy_batch);
    return big + bent;
}

CLOTHI_RARE_BEGIN

/* Element forces at e->x, w.x, into the force buffer; winged: all as forces of triangles. */
static void clothi_leap_elements(cloth_sim *s, const cloth_eval *e) {
    const cloth_model *m = s->model;
    const int width = m->bend.kind == CLOTHI_QUADRATIC ? 3 : 1;
    double    energy;
    int       k;
    if (!clothi_leap_winged(s)) {
        (void)clothi_elements_eval(&s->own.membrane, e, &energy);
        (void)clothi_elements_eval(&s->own.bend, e, &energy);
        return;
    }
    for (k = 0; k < width; k++)             /* of a boundary */
        s->own.force[m->bend.force + m->bend.nbatch * CLOTHI_LANES * width + k] = 0;
    clothi_for(&s->hooks, m->bend.nbatch, CLOTHI_CHUNK, clothi_leap_pulls, s);
    clothi_for(&s->hooks, m->membrane.nbatch, CLOTHI_CHUNK, clothi_leap_triangles, s);
    s->own.counts.triangles += m->membrane.count;
    s->own.counts.hinges += m->bend.count;
}

/* Element forces at w.x into the force buffer, and the other terms into w.grad when there are
 * any; *extra is w.grad or NULL. */
static cloth_status clothi_leap_force(cloth_sim *s, cloth_eval *e, const double **extra) {
    const int    damped = s->own.tau > 0;
    cloth_status status = CLOTH_OK;
    int i, others = s->force_on || s->nattach > 0 || s->wind_on || s->nterms > s->nbuiltin;
    e->x = s->w.x, e->grad = s->w.grad, e->hess = NULL;
    *extra = NULL;
    if (damped) {                           /* strain rates: against x - h v, the last substep */
        for (i = 0; i < 3 * s->model->nv; i++)
            s->w.dx[i] = s->w.x[i] - e->h * s->w.trial[i];
        e->x_n = s->w.dx;
        status = clothi_terms_some(s, e, 0, CLOTHI_TERM_BEND + 1);
    }
    s->own.force_only = !(s->balance && damped);
    clothi_leap_elements(s, e);
    s->own.force_only = 0;
    if (!others || status) return status;
    memset(s->w.grad, 0, 3 * (size_t)s->model->nv * sizeof(double));
    e->x_n = s->w.x, e->v_n = s->w.trial;
    e->h = 0;                               /* wind: at the velocity it has */
    for (i = CLOTHI_TERM_FORCE; i < s->nterms && !status; i++) {
        if (s->term[i].begin) status = s->term[i].begin(s->term[i].user, e);
        if (!status) status = s->term[i].eval(s->term[i].user, e, s->term_energy + i);
    }
    *extra = s->w.grad;
    return status;
}

/* omega_max of the template at rest. The start vector is fixed: the result is a function of model
 * and params. The power method, u <- M^-1 K u, comes from below, so CLOTHI_LEAP_MARGIN is added. */
static void clothi_leap_omega(cloth_sim *s) {
    const double *mass = s->params.mass;
    double       *u = s->w.dx, *Ku = s->w.y, lambda = 0, norm, big;
    int           n = 3 * s->model->nv, i, k;
    uint64_t      seed = 0x9e3779b97f4a7c15u;
    for (i = 0; i < n; i++) {
        seed = seed * 6364136223846793005u + 1442695040888963407u;
        u[i] = (double)(seed >> 11) / 9007199254740992.0 - 0.5;
    }
    for (k = 0; k < CLOTHI_LEAP_POWER; k++) {
        clothi_hessian_times(s, NULL, s->model->x_rest, u, Ku);
        for (i = 0, norm = 0; i < n; i++) norm += mass[i / 3] * u[i] * u[i];
        lambda = clothi_max(lambda, norm > 0 ? clothi_dot(u, Ku, (size_t)n) / norm : 0);
        for (i = 0; i < n; i++) Ku[i] /= mass[i / 3];
        big = clothi_max_abs(Ku, n);
        if (!(big > 0)) break;
        for (i = 0; i < n; i++) u[i] = Ku[i] / big;
    }
    s->omega_rest = sqrt(lambda) * CLOTHI_LEAP_MARGIN;
    s->omega_bend = clothi_leap_bends(s, s->model->x_rest);
    if (!(s->omega_bend > CLOTHI_LEAP_BENDS * lambda)) s->omega_bend = 0;
}

/* omega^2 that attachments and hosts' terms add, at most: the largest row sum of |M^-1 K|, of
 * attachments K_ij = k w_i w_j, of terms as declared, at the lightest vertex. */
static double clothi_leap_attach(const cloth_sim *s) {
    double *sum = s->w.inv_mass + s->model->nv, big = 0, stiff = 0, host = 0, r[3], w[6], all;
    int     i, k, n, v[6];
    for (i = s->nbuiltin; i < s->nterms; i++) stiff += s->term[i].stiffness;
    for (i = 0; stiff > 0 && i < s->model->nv; i++)
        host = clothi_max(host, stiff / s->params.mass[i]);
    if (s->nattach == 0) return host;
    memset(sum, 0, (size_t)s->model->nv * sizeof *sum);
    for (i = 0; i < s->model->desc.max_attachments; i++) {
        n = clothi_attach_gap(s->model, NULL, s->attach + i, s->state.x, v, w, r);
        for (k = 0, all = 0; k < n; k++) all += s->attach[i].k * fabs(w[k]);
        for (k = 0; k < n; k++)
            big = clothi_max(big, sum[v[k]] += all * fabs(w[k]) / s->params.mass[v[k]]);
    }
    return big + host;
}

/* The tangent factor up to which a substep of hs is stable: clothi_leap_limit() turned round,
 * omega^2 = 1 / (hs^2/4 + tau hs/2). */
static double clothi_leap_bears(const cloth_sim *s, double hs) {
    return (1 / (0.25 * hs * hs + 0.5 * s->own.tau * hs) - clothi_leap_attach(s)) /
           (s->omega_rest * s->omega_rest);
}

/* 1/s, at most, of what wind takes off speeds where it began last: row sums of M^-1 dF/dv, F as
 * c |u| u. */
static double clothi_leap_gust(const cloth_sim *s) {
    const cloth_model *m = s->model;
    double            *sum = s->w.inv_mass + m->nv, big = 0;
    int                i;
    if (!s->wind_on) return 0;
    memset(sum, 0, (size_t)m->nv * sizeof *sum);
    for (i = 0; i < 3 * m->nf; i++) {
        const double *c = s->own.wind + 5 * (size_t)(i / 3) + 3;
        sum[m->faces[i]] += 2 * clothi_max(c[0], c[1]) / (3 * s->params.mass[m->faces[i]]);
        big = clothi_max(big, sum[m->faces[i]]);
    }
    return big;
}

/* Largest stable substep, s, for a tangent factor and a gust. */
static double clothi_leap_limit(const cloth_sim *s, double tangent, double gust,
                                double *omega_out) {
    const double omega = sqrt(s->omega_rest * s->omega_rest * tangent + clothi_leap_attach(s)),
                 r = s->own.tau * omega * omega + gust, all = r + sqrt(r * r + 4 * omega * omega);
    *omega_out = omega;
    return all > 0 ? 4 / all : HUGE_VAL;
}

/* Velocity of what is pinned, from the first kick on; the hand that speeds it up works. */
static void clothi_leap_pins(clothi_leap *p, double h) {
    cloth_sim *s = p->s;
    int        i;
    for (i = 0; i < 3 * s->model->nv; i++) {
        double *v = s->w.trial + i;
        s->w.y[i] = 0;
        if (!(s->pin[i / 3] >> (i % 3) & 1)) continue;
        s->w.y[i] = s->fraction * (s->target[i] - s->w.x0[i]) / h;
        if (p->ledger)
            p->ledger->pin_work += 0.5 * s->params.mass[i / 3] * (s->w.y[i] * s->w.y[i] - *v * *v);
        *v = s->w.y[i];
    }
}

/* Before a kick with the forces of clothi_leap_force(). A kick by F does the work kick F.(v + v')/2
 * on the velocities v before and v' after it, exactly. h: of the step, hs: of the substep. */
static cloth_status clothi_leap_works(clothi_leap *p, cloth_eval *e, double h, double hs) {
    cloth_sim         *s = p->s;
    const cloth_model *m = s->model;
    cloth_ledger      *l = p->ledger;
    cloth_status       status;
    double             f[3], value;
    int                i, j, k;
    l->damping_loss += 2 * (s->own.membrane.loss + s->own.bend.loss) * p->kick / hs;
    for (i = 0; i < m->nv; i++) {
        if (!s->pin[i]) continue;
        f[0] = f[1] = f[2] = 0;
        for (k = m->gather_start[i]; k < p->stop[i]; k++)
            for (j = 0; j < 3; j++) f[j] += s->own.force[m->gather[k] + j * CLOTHI_LANES];
        for (j = 0; j < 3; j++) {
            if (p->extra) f[j] += p->extra[3 * i + j];
            l->pin_work += p->kick * (f[j] - s->params.mass[i] * s->gravity[j]) * s->w.y[3 * i + j];
        }
    }
    l->pin_work += clothi_attach_work(s, s->w.x, p->kick / h);
    if (!s->wind_on) return CLOTH_OK;
    memset(s->w.rhs, 0, 3 * (size_t)m->nv * sizeof(double));
    e->grad = s->w.rhs;
    status = s->term[CLOTHI_TERM_WIND].eval(s->term[CLOTHI_TERM_WIND].user, e, &value);
    p->wind = clothi_dot(s->w.rhs, s->w.trial, 3 * (size_t)m->nv);
    return status;
}

/* Energy of x with the velocity w.rhs, which takes the half kick that ends a substep. */
static cloth_status clothi_leap_energy(cloth_sim *s, const double *x, double hs, cloth_ledger *l) {
    const cloth_status status = clothi_energy_at(s, x, s->w.rhs, 1, l);
    int                i;
    if (status) return status;
    for (i = 0; i < 3 * s->model->nv; i++)
        if (!(s->pin[i / 3] >> (i % 3) & 1))
            s->w.rhs[i] -= 0.5 * hs * s->w.grad[i] / s->params.mass[i / 3];
    clothi_ledger_total(s, s->w.rhs, l);
    return CLOTH_OK;
}

/* The ledger of what contact did to the candidate, which was in w.dx with its velocity in w.rhs. */
static cloth_status clothi_leap_balance(cloth_sim *s, double hs, cloth_ledger *l) {
    const size_t bytes = 3 * (size_t)s->model->nv * sizeof(double);
    cloth_ledger a, b;
    cloth_status status;
    int          i;
    if (s->contact.balance) s->contact.balance(s->contact.user, l);
    if (memcmp(s->w.x, s->w.dx, bytes) == 0 && memcmp(s->w.trial, s->w.rhs, bytes) == 0)
        return CLOTH_OK;
    status = clothi_leap_energy(s, s->w.dx, hs, &a);
    memcpy(s->w.rhs, s->w.trial, bytes);
    if (!status) status = clothi_leap_energy(s, s->w.x, hs, &b);
    if (status) return status;
    l->zone_loss += a.total - b.total;
    for (i = 0; s->force_on && i < 3 * s->model->nv; i++)
        l->zone_loss += s->force[i] * (s->w.x[i] - s->w.dx[i]);
    return status;
}

/* Contact over the drift of a substep, from w.x: before it, and at its end, where x and v become
 * feasible. l: NULL where no report is wanted. */
static cloth_status clothi_leap_contact(cloth_sim *s, double hs, int end, cloth_ledger *l) {
    const size_t bytes = 3 * (size_t)s->model->nv * sizeof(double);
    double      *was;
    clothi_goal  goal;
    cloth_status status;
    if (clothi_find_nonfinite(s->w.x, bytes / sizeof(double)) >= 0) return CLOTH_OK;
    was = clothi_charge(s, &s->ms.contact);
    clothi_eval_start(s, &goal, hs);
    goal.e.x_n = s->w.x, goal.e.v_n = s->w.trial;
    s->own.counts.contact_calls++;
    if (end && l) {
        memcpy(s->w.dx, s->w.x, bytes);
        memcpy(s->w.rhs, s->w.trial, bytes);
    }
    if (end && s->landing) {
        memcpy(s->landing, s->w.x, bytes);
        memcpy(s->landing + bytes / sizeof(double), s->w.trial, bytes);
    }
    status = end ? s->contact.resolve(s->contact.user, &goal.e, s->w.x, s->w.trial)
                 : s->contact.begin(s->contact.user, &goal.e);
    (void)clothi_charge(s, was);
    return status || !end || !l ? status : clothi_leap_balance(s, hs, l);
}

/* Substeps from w.x0, w.v0 to w.x and w.trial (the velocity); *tangent, *gust: the largest met */
static cloth_status clothi_leap_run(cloth_sim *s, double h, int substeps, double *tangent,
                                    double *gust, cloth_ledger *ledger) {
    const cloth_model *m = s->model;
    int          i, k, n = 3 * m->nv;
    double       hs = h / substeps, bears = clothi_leap_bears(s, hs), omega;
    clothi_leap  p;
    cloth_eval   e = clothi_eval_of(s);
    cloth_status status = CLOTH_OK;
    p.s = s;
    p.stop = clothi_leap_winged(s) ? m->gather_mid : m->gather_start + 1;
    p.ledger = ledger;
    memcpy(s->w.x, s->w.x0, (size_t)n * sizeof(double));
    memcpy(s->w.trial, s->w.v0, (size_t)n * sizeof(double));
    for (i = 0; i < m->nv; i++) s->w.inv_mass[i] = 1 / s->params.mass[i];
    clothi_leap_pins(&p, h);
    for (k = 0; k <= substeps && !status; k++) {
        e.t = s->state.t + k * hs;
        e.h = hs;
        clothi_input(s, hs, (double)k / substeps, (double)(k + 1) / substeps);
        s->in.t = e.t, s->in.x = s->w.x, s->in.v = s->w.trial;
        if (s->contact_on && k < substeps) status = clothi_leap_contact(s, hs, 0, ledger);
        s->in.share[1] = s->in.share[0];    /* forces are those at its start */
        if (!status) clothi_recorded(s, s->w.x);
        if (!status) status = clothi_leap_force(s, &e, &p.extra);
        p.kick = k == 0 || k == substeps ? 0.5 * hs : hs;
        p.drift = k < substeps ? hs : 0;
        p.alpha = s->fraction * (k < substeps ? k + 1 : k) / substeps;
        if (k == substeps || k % CLOTHI_LEAP_WATCH == 1 || *tangent > CLOTHI_LEAP_PRESSED) {
            *tangent = clothi_max(*tangent, clothi_leap_tangent(s, s->w.x, bears));
            *gust = clothi_max(*gust, clothi_leap_gust(s));
            if (!(hs <= clothi_leap_limit(s, *tangent, *gust, &omega))) break;
        }
        if (!status && ledger) status = clothi_leap_works(&p, &e, h, hs);
        if (!status) clothi_for(&s->hooks, m->nv, CLOTHI_VERTICES, clothi_leap_range, &p);
        if (!status && ledger && s->wind_on)
            ledger->wind_work -=
                0.5 * p.kick * (p.wind + clothi_dot(s->w.rhs, s->w.trial, (size_t)n));
        if (!status && s->contact_on && k < substeps) {
            s->in.share[1] = p.alpha;
            status = clothi_leap_contact(s, hs, 1, ledger);
            if (status == CLOTH_ERR_STEP)   /* for want of substeps? */
                *tangent = clothi_max(*tangent, clothi_leap_tangent(s, s->w.x, bears));
        }
        if (!status && k < substeps && k % 16 == 0)
            status = clothi_cancelled(&s->hooks, &s->finish);
    }
    return status;
}

/* Substeps of h, q safe ones long: q and a reserve, up to half as many again to keep the last. */
static int clothi_leap_substeps(const cloth_sim *s, double h, double q) {
    const double need = ceil(clothi_max(1, q + clothi_min(q, CLOTHI_LEAP_RESERVE)));
    const double last = s->h_prev > 0 ? ceil(h / s->h_prev - 1e-6) : 0;
    return (int)clothi_max(need, clothi_min(last, floor(1.5 * need)));
}

static cloth_status clothi_leap_unstable(const cloth_sim *s, double h, int m, double limit) {
    return clothi_fail(&s->hooks, CLOTH_ERR_STEP, "LEAPFROG: %s%i substeps of %g s are beyond the "
                       "stability limit %g s", s->model->desc.substeps ? "desc.substeps = " : "",
                       m, h / m, limit);
}

/* The substeps of a step of h from w.x0: what the desc asks for, if that is stable, or enough. */
static cloth_status clothi_leap_count(cloth_sim *s, double h, int *m) {
    cloth_eval e = clothi_eval_of(s);
    double     limit, safe;
    e.x_n = s->w.x0, e.v_n = s->w.v0;
    (void)clothi_wind_begin(&s->own, &e);
    limit = clothi_leap_limit(s, clothi_leap_tangent(s, s->w.x0, 1), clothi_leap_gust(s),
                              &s->report.omega_max);
    safe = CLOTHI_LEAP_SAFETY * limit;
    *m = s->model->desc.substeps;
    if (!clothi_finite(s->report.omega_max) || !(limit > 0))
        return clothi_fail(&s->hooks, CLOTH_ERR_NONFINITE, "LEAPFROG: the stability limit is %g s "
                           "at omega = %g 1/s", limit, s->report.omega_max);
    s->report.outcome = CLOTH_STEP_STALLED;
    if (*m > 0 && h / *m > limit) return clothi_leap_unstable(s, h, *m, limit);
    if (*m == 0 && !(h / safe < CLOTHI_MAX_SUBSTEPS))
        return clothi_fail(&s->hooks, CLOTH_ERR_STEP, "LEAPFROG needs more than %i substeps of "
                           "%g s", CLOTHI_MAX_SUBSTEPS, safe);
    if (*m == 0) *m = clothi_leap_substeps(s, h, h / safe);
    return CLOTH_OK;
}

static void clothi_put_back(cloth_sim *s, cloth_report *report) {
    (void)clothi_walked(s, CLOTHI_LOAD, s->kept, CLOTHI_PARAM, s->nterms - s->nbuiltin);
    if (s->contact_on && s->contact.rollback) s->contact.rollback(s->contact.user, report);
}

static cloth_status clothi_step_leapfrog(cloth_sim *s, double h) {
    const size_t n = 3 * (size_t)s->model->nv;
    double       after, gust, limit, omega;
    cloth_status status;
    cloth_ledger ledger;
    size_t       i;
    int          m, tries = s->model->desc.substeps > 0 ? CLOTHI_LEAP_RETRIES : 0;   /* one */
    if (!(s->omega_rest > 0)) clothi_leap_omega(s);
    status = clothi_leap_count(s, h, &m);
    if (status) return status;
    for (;; tries++, m *= 2) {
        after = gust = 0;
        memset(&ledger, 0, sizeof ledger);
        status = clothi_leap_run(s, h, m, &after, &gust, s->balance ? &ledger : NULL);
        s->report.substeps += m;
        limit = clothi_leap_limit(s, after, gust, &omega);
        if (!status && h / m <= limit && clothi_find_nonfinite(s->w.x, n) < 0 &&
            clothi_find_nonfinite(s->w.trial, n) < 0)
            break;
        if (tries < CLOTHI_LEAP_RETRIES &&
            (!status || (status == CLOTH_ERR_STEP && !(h / m <= limit)))) {
            clothi_put_back(s, NULL);
            continue;
        }
        if (status == CLOTH_ERR_STEP) s->report.outcome = CLOTH_STEP_COLLISION_FAILED;
        if (!status) status = clothi_check_vertices(s, "step: x", s->w.x);
        if (!status) status = clothi_check_vertices(s, "step: v", s->w.trial);
        return status ? status : clothi_leap_unstable(s, h, m, limit);
    }
    for (i = (size_t)s->nbuiltin; i < (size_t)s->nterms; i++)   /* forces alone do not show it */
        if (!clothi_finite(s->term_energy[i]))
            return clothi_check_terms(s, s->term_energy[i]);
    s->report.energy = ledger;
    for (i = 0; s->force_on && i < n; i++)
        s->report.energy.force_work += s->force[i] * (s->w.x[i] - s->w.x0[i]);
    memcpy(s->state.x, s->w.x, n * sizeof(double));
    memcpy(s->state.v, s->w.trial, n * sizeof(double));
    s->state.t += h;
    s->h_prev = h / m;
    s->report.outcome = CLOTH_STEP_CONVERGED;
    return CLOTH_OK;
}

/* ===== [9.5] THE STEP ========================================================================
 *
 *   check x v targets h  ->  keep a copy  ->  substeps  ->  accept, or put the copy back
 *
 * Whatever goes wrong, the state afterwards has the hash it had before.
 * checked: tests/test_step.c (one test per row of the table at cloth_step)
 */

static cloth_status clothi_need_work(cloth_sim *s) {
    const cloth_model *m = s->model;
    const size_t n = 3 * (size_t)m->nv;
    const size_t na = (size_t)m->membrane.nbatch * CLOTHI_LANES;
    const size_t nb = (size_t)m->bend.nbatch * CLOTHI_LANES;
    const size_t ma = (size_t)s->own.membrane.kind->nmeasure + 1;
    const size_t mb = (size_t)s->own.bend.kind->nmeasure + 1;
    const int    implicit = m->desc.integrator != CLOTH_INTEGRATOR_LEAPFROG;
    const int    damped = s->own.tau > 0;
    const size_t most = na > nb ? na : nb, room = (size_t)m->force_size + most + n;
    const struct { double **array; size_t n; int wanted; } need[] = {
        {&s->w.x, n, 1}, {&s->w.dx, n, 1}, {&s->w.grad, n, 1}, {&s->w.y, n, 1},
        {&s->w.rhs, n, 1}, {&s->w.inv_mass, n, !implicit},
        {&s->w.partial, (n / 3) / CLOTHI_VERTICES + 1, 1}, {&s->w.room, room, !implicit},
        {&s->own.loss_batch, most, damped},
        {&s->own.wind, 5 * (size_t)m->nf, s->wind_on}, {&s->w.free, n, s->contact_on && implicit},
        {&s->own.membrane.start, na * ma, damped}, {&s->own.bend.start, nb * mb, damped}};
    cloth_status status = clothi_fields_need(s, CLOTHI_INPUT);
    size_t       i;
    for (i = 0; i < sizeof need / sizeof *need && !status; i++)
        if (need[i].wanted) status = clothi_need(s, need[i].array, need[i].n);
    if (!status && implicit && !s->matrix)
        status = cloth_matrix_create(&s->hooks, m->pattern, &s->matrix);
    if (!status && implicit && !s->solver)
        status = cloth_linear_solver_create(&s->hooks, m->pattern, &s->solver);
    if (!status && implicit) {
        s->solver->least = room * sizeof(double);
        status = clothi_solver_reserve(s->solver, s->matrix);
    }
    if (status) return status;
    s->own.force = implicit ? (double *)s->solver->block : s->w.room;
    s->own.energy_batch = s->own.force + m->force_size;
    s->w.trial = s->own.energy_batch + most;
    return CLOTH_OK;
}

static cloth_status clothi_check_state(cloth_sim *s) {
    cloth_status status = clothi_check_vertices(s, "state.x", s->state.x);
    if (!status) status = clothi_check_vertices(s, "state.v", s->state.v);
    if (!status) status = clothi_check_vertices(s, "target", s->target);
    if (status || clothi_finite(s->state.t)) return status;
    return clothi_fail(&s->hooks, CLOTH_ERR_NONFINITE, "state.t = %g", s->state.t);
}

static cloth_status clothi_check_step(cloth_sim *s) {
    if (s->model->desc.contact != CLOTH_CONTACT_NONE && !s->contact_on)
        return clothi_fail(&s->hooks, CLOTH_ERR_UNSUPPORTED, "desc.contact = %s needs "
                           "clothsim_collide.h: this sim has no contact",
                           s->model->desc.contact == CLOTH_CONTACT_SELF
                               ? "CLOTH_CONTACT_SELF" : "CLOTH_CONTACT_OBSTACLES");
    return clothi_check_state(s);
}

#define CLOTHI_COLLAPSED 0.57735026918962576 /* 1/sqrt(3), where StVK softens              */
#define CLOTHI_FOLDED    3.0                /* rad                                             */

/* The energies at the start of a step are those at the end of the last one, bit for bit, while
 * nothing that they depend on has changed: x is compared, what else could change clears `known`. */
static cloth_status clothi_energy_before(cloth_sim *s, int known, cloth_ledger *l) {
    if (!known || memcmp(s->state.x, s->w.x, 3 * (size_t)s->model->nv * sizeof(double)))
        return clothi_energy_at(s, s->state.x, s->state.v, 0, l);
    *l = s->ledger;
    clothi_ledger_total(s, s->state.v, l);
    return CLOTH_OK;
}

/* Smallest stretch; eight triangles at a time, and the smallest one once more, exactly. */
static void clothi_report_shape(cloth_sim *s) {
    enum { L = CLOTHI_LANES };
    const clothi_group *g = &s->model->membrane, *h = &s->model->bend;
    const int     lanes = g->kind == CLOTHI_TRIANGLE;
    cloth_report *report = &s->report;
    double        x[12 * L], shape[L], high[L], low = HUGE_VAL, both[2], corners[9];
    int           b, k, f;
    for (f = 0; !lanes && f < s->model->nf; f++) {
        const double stretch = clothi_face_stretch(s, s->state.x, f, both, corners);
        report->collapsed += stretch < CLOTHI_COLLAPSED;
        if (stretch < low) low = stretch, report->min_stretch_face = f;
    }
    for (b = 0; lanes && b < g->nbatch; b++) {
        clothi_corners(g, s->state.x, b, x);
        clothi_stretch_squares(x, s->own.membrane.rest + (size_t)b * 7 * L, shape, high);
        for (k = 0; k < L; k++) {
            if ((f = g->id[b * L + k]) < 0) continue;
            report->collapsed += shape[k] < CLOTHI_COLLAPSED * CLOTHI_COLLAPSED;
            if (shape[k] < low || (shape[k] <= low && f < report->min_stretch_face))
                low = shape[k], report->min_stretch_face = f;
        }
    }
    f = report->min_stretch_face;
    report->min_stretch = f < 0 ? HUGE_VAL : clothi_face_stretch(s, s->state.x, f, both, corners);
    for (b = 0; b < h->nbatch; b++) {
        clothi_corners(h, s->state.x, b, x);
        clothi_hinge_measure(x, x, shape);
        for (k = 0; k < L; k++)
            report->folded += h->id[b * L + k] >= 0 && fabs(shape[k]) > CLOTHI_FOLDED;
    }
}

/* Bytes, and where the state is `news` what is told of it. */
static void clothi_report_state(cloth_sim *s, int news) {
    const cloth_model *m = s->model;
    cloth_bytes       *b = &s->report.bytes;
    double             c[3];
    int                i, k;
    if (news) clothi_report_shape(s);
    for (i = 0; i < m->nv && news; i++) {
        clothi_cross3(s->state.x + 3 * i, s->state.v + 3 * i, c);
        for (k = 0; k < 3; k++) {
            s->report.momentum[k] += s->params.mass[i] * s->state.v[3 * i + k];
            s->report.angular[k] += s->params.mass[i] * c[k];
        }
    }
    b->mesh = clothi_blocks(NULL, m->block, (size_t)m->nmesh) + clothi_block_size(m->topology) +
              clothi_block_size(m);
    b->elements = clothi_blocks(NULL, m->block + m->nmesh, (size_t)(m->nblock - m->nmesh)) +
                  clothi_own_blocks(&s->own, NULL);
    b->matrix = cloth_pattern_bytes(m->pattern) + cloth_matrix_bytes(s->matrix);
    b->factor = cloth_linear_solver_bytes(s->solver);
    b->state = clothi_state_blocks(s, NULL);
    b->scratch = clothi_work_blocks(s, NULL) + clothi_block_size(s);
    b->contact = s->contact_on && s->contact.bytes ? s->contact.bytes(s->contact.user) : 0;
    b->total = b->mesh + b->elements + b->matrix + b->factor + b->state + b->scratch + b->contact;
}

/* --- the driver --- */

/* Room for `need` bytes in *block; `more` when it has to grow. */
static cloth_status clothi_room(cloth_sim *s, unsigned char **block, size_t need, size_t more) {
    const size_t extra = CLOTHI_ALIGN + sizeof(clothi_block_header);
    if (need == 0 || need + extra <= clothi_block_size(*block)) return CLOTH_OK;
    clothi_free(&s->hooks, *block);
    *block = (unsigned char *)clothi_alloc(&s->hooks, need + more, 1);
    return *block ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

/* What the step starts from into `kept`: it is put back where the step fails, and recorded where it
 * does not. Contact has a rollback of its own. */
static cloth_status clothi_keep(cloth_sim *s) {
    const int    units = s->nterms - s->nbuiltin + (s->recorder.step != NULL);
    const size_t fields = clothi_walked(s, CLOTHI_SIZE, NULL, CLOTHI_PARAM, 0);
    const size_t all = clothi_walked(s, CLOTHI_SIZE, NULL, CLOTHI_PARAM, units);
    cloth_status status = clothi_room(s, &s->kept, all, all - fields);
    if (status) return status;
    s->recorded = clothi_walked(s, CLOTHI_SAVE, s->kept, CLOTHI_PARAM, units);
    s->w.x0 = (double *)(void *)s->kept;
    s->w.v0 = s->w.x0 + 3 * (size_t)s->model->nv;
    return CLOTH_OK;
}

/* Before a step is accepted: room for *n contacts in its record. */
static cloth_status clothi_record_need(cloth_sim *s, int *n) {
    size_t need;
    *n = s->contact_on && s->contact.contacts ? s->contact.contacts(s->contact.user, 0, NULL) : 0;
    need = (size_t)*n * s->contact.contact_size;
    return clothi_room(s, &s->touching, need, need);
}

/* After it was. */
static void clothi_record_give(cloth_sim *s, double h, int n) {
    cloth_step_record r = {s->model->hash, h, s->kept, s->recorded, s->model->nv, s->state.x,
                           s->state.v, s->report.outcome, n, NULL};
    r.contact = (const struct cloth_collide_contact *)(void *)s->touching;
    if (n) (void)s->contact.contacts(s->contact.user, n, s->touching);
    s->recorder.step(s->recorder.user, &r);
}

/* --- sleep --- */

/* Something of contact is under way. */
static int clothi_moves(const cloth_sim *s) {
    return s->contact_on && s->contact.moves && s->contact.moves(s->contact.user);
}

/* The step that begins finds all as the one that fell asleep has left it. */
static int clothi_sleeps(const cloth_sim *s) {
    const size_t n = 3 * (size_t)s->model->nv;
    int          i;
    if (!(s->model->desc.sleep > 0) || s->still < s->model->desc.sleep) return 0;
    for (i = 0; s->nattach > 0 && i < s->model->desc.max_attachments; i++)
        if (memcmp(s->attach[i].pose, s->attach[i].target, sizeof s->attach[i].pose)) return 0;
    return memcmp(s->state.x, s->still_x, n * sizeof(double)) == 0 &&
           !(clothi_max_abs(s->state.v, (int)n) > 0) && !clothi_moves(s);
}

/* At the end of a step that did not sleep: how long the sim has been at rest. The free corners of a
 * folded sheet went to and fro by 2.3 tolerances without end. */
static void clothi_watch(cloth_sim *s, double h) {
    const size_t bytes = 3 * (size_t)s->model->nv * sizeof(double);
    const double most = 4 * s->model->desc.tolerance;
    double       still = s->still < s->model->desc.sleep ? s->still : 0;    /* woken: from now */
    s->rested.outcome = CLOTH_STEP_NONE;
    if (!(s->model->desc.sleep > 0)) return;
    if (!(still > 0)) memcpy(s->still_x, s->w.x0, bytes);
    still = clothi_moves(s) ? 0 : still + h;
    if (still > 0 && clothi_apart2(s->state.x, s->still_x, s->model->nv) > most * most) still = 0;
    if (still >= s->model->desc.sleep) {
        clothi_forget(s);
        memset(s->state.v, 0, bytes);
        memcpy(s->still_x, s->state.x, bytes);
    }
    s->still = still;
}

/* Substeps of the implicit step that begins; most: that any step may have. */
static int clothi_substeps(const cloth_sim *s, int most) {
    int m = s->model->desc.substeps;
    if (m == 0 && s->model->desc.contact != CLOTH_CONTACT_NONE && (most || s->contact.substeps)) {
        m = most ? CLOTH_SUBSTEPS_ASKED : s->contact.substeps(s->contact.user);
        if (m > CLOTH_SUBSTEPS_ASKED) m = CLOTH_SUBSTEPS_ASKED;
    }
    return m > 1 ? m : 1;
}

/* A step of h, or statics where that is 0. */
static cloth_status clothi_step_run(cloth_sim *s, double h) {
    const int    leap = s->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG;
    cloth_status status = CLOTH_OK;
    int          k, m;
    if (!(h > 0)) return clothi_static_run(s);
    if (s->asleep) {
        s->state.t += h;
        s->report.outcome = CLOTH_STEP_ASLEEP;
        if (s->balance && !s->rested.outcome && s->contact_on && s->contact.balance)
            s->contact.balance(s->contact.user, &s->report.energy);
        return CLOTH_OK;
    }
    if (leap) status = clothi_step_leapfrog(s, h);
    else s->report.outcome = CLOTH_STEP_CONVERGED;
    m = leap ? 0 : clothi_substeps(s, 0);
    for (k = 0; k < m && !status; k++) {
        clothi_input(s, h / m, (double)k / m, (double)(k + 1) / m);
        status = clothi_substep_implicit(s);
    }
    if (!status) clothi_watch(s, h);
    return status;
}

/* n numbers x, `part` of the way to `to`, and there exactly. */
static void clothi_go(double *x, const double *to, int n, double part) {
    int i;
    for (i = 0; i < n; i++) x[i] = part < 1 ? x[i] + part * (to[i] - x[i]) : to[i];
}

/* Accepted: attachments have arrived, contact anchors become state. */
static void clothi_accept(cloth_sim *s) {
    int i;
    for (i = 0; s->nattach > 0 && i < s->model->desc.max_attachments; i++)
        clothi_go(s->attach[i].pose, s->attach[i].target, 3, s->fraction);
    if (s->contact_on) s->contact.commit(s->contact.user, &s->report);
    s->taken = s->fraction, s->fraction = 1;
}

/* The ledger of a step, where a report is wanted or it is watched. */
static cloth_status clothi_book(cloth_sim *s, const cloth_ledger *before) {
    cloth_ledger l = s->report.energy;
    cloth_status status = CLOTH_OK;
    const int    builtin = s->nterms == s->nbuiltin;    /* a host's energy may depend on h */
    clothi_input(s, 0, 1, 1);
    if (s->fresh && builtin) {
        clothi_ledger_terms(s, &l);
        clothi_ledger_total(s, s->state.v, &l);
    } else
        status = clothi_energy_at(s, s->state.x, s->state.v, 0, &l);
    s->ledger = l;
    s->known = s->fresh && builtin && !s->contact_on && !s->nattach && !(s->own.tau > 0);
    l.numerical_loss = before->total + l.wind_work + l.force_work + l.pin_work + l.contact_work -
                       l.damping_loss - l.friction_loss - l.zone_loss - l.total;
    s->report.energy = l;
    return status;
}

#define CLOTHI_GROWTH  0.02                 /* of what moves and is strained: energy from nowhere */
#define CLOTHI_GROWN   0.5                  /* the same in BDF2's step that was solved again   */

/* BDF2 extrapolates what a search that was cut short has left, and that may grow for ever; under
 * Euler cloth that is torn about, or pushed, may stay strained as the guess has it. */
static int clothi_watched(const cloth_sim *s, double h) {
    const cloth_desc *d = &s->model->desc;
    return (d->integrator == CLOTH_INTEGRATOR_BDF2 ||
            (d->integrator == CLOTH_INTEGRATOR_EULER && d->max_newton > 0)) &&
           h > 0 && !s->asleep;
}

/* From where energy is watched in steps that are cut short, m/s by axis: from pins, else what cloth
 * is attached to, as they go in the step, else the mean of cloth as it begins. From rest, the ride
 * or the fall of all would hide what parts gain: tests/test_step.c, cut_short_on_a_ride. */
static void clothi_watch_from(cloth_sim *s, double h) {
    const double whole = h / s->fraction;   /* s, all the way to targets */
    int          i, k, of;
    for (k = 0; k < 3; k++) {
        double mass[3] = {0, 0, 0}, way[3] = {0, 0, 0};     /* cloth, attachments, pins */
        for (i = k; i < 3 * s->model->nv; i += 3) {
            of = s->pin[i / 3] >> k & 1 ? 2 : 0;
            mass[of] += s->params.mass[i / 3];
            way[of] += s->params.mass[i / 3] * (of ? (s->target[i] - s->state.x[i]) / whole
                                                   : s->state.v[i]);
        }
        for (i = 0; s->nattach && i < s->model->desc.max_attachments; i++) {
            const cloth_step_attachment *q = s->attach + i;
            if (q->used && q->on >= 0) mass[1]++, way[1] += (q->target[k] - q->pose[k]) / whole;
        }
        of = mass[2] > 0 ? 2 : mass[1] > 0;
        s->frame[k] = way[of] / mass[of];
    }
}

/* J, what the step gained that no work explains; from s->frame forces work less by frame times
 * impulse. What contact takes in a search that was cut short does not count. was: the kinetic
 * energy before; *of: what moves and is strained. */
static double clothi_gain(const cloth_sim *s, double h, const cloth_ledger *before, double was,
                          double *of) {
    const cloth_ledger *l = &s->report.energy;
    const double is = s->model->desc.max_newton > 0 ? clothi_kinetic(s, s->state.v, s->frame)
                                                    : l->kinetic;
    const double all = clothi_dot3(s->frame, s->pushed[0]);
    const double touch = clothi_dot3(s->frame, s->pushed[1]);
    *of = was + before->stretch + before->bend + fabs(before->other) + is + l->stretch + l->bend +
          fabs(l->other) + s->total * h * h * clothi_dot3(s->gravity, s->gravity);
    return is + l->total - l->kinetic - l->other - was - before->total + before->kinetic +
           before->other + s->hosted - l->wind_work - l->force_work - l->pin_work + all - touch -
           clothi_max(l->contact_work - touch, 0);
}

/* A run with its ledger. A step of energy that no work explains is taken again by implicit Euler,
 * which forgets, as the next one does: with twice as many iterations each time, from x^n moved with
 * s->frame where nothing is in the way, as that strains nothing, and at last without
 * desc.max_newton; where time is up the next alone. What is solved to the tolerance stands: pins
 * and attachments are booked by the forces at its end, which may turn in it. */
static cloth_status clothi_booked(cloth_sim *s, double h, const cloth_ledger *before) {
    const double least = CLOTHI_REST * s->model->desc.tolerance / h;    /* m/s: rest rounds to it */
    const int    bdf2 = s->model->desc.integrator == CLOTH_INTEGRATOR_BDF2;
    const int    capped = s->model->desc.max_newton > 0, watched = clothi_watched(s, h);
    cloth_status status = CLOTH_OK;
    double       was = before->kinetic, gain, most;
    int          last;
    if (watched && capped) {
        clothi_watch_from(s, h);
        was = clothi_kinetic(s, s->state.v, s->frame);
    }
    for (s->calm = 0; !status; s->calm = capped ? s->calm + 1 : CLOTHI_RETAKES) {
        last = s->calm == CLOTHI_RETAKES;
        s->hosted = 0;
        memset(s->pushed, 0, sizeof s->pushed);
        status = clothi_step_run(s, h);
        if (!status) status = clothi_book(s, before);
        if (status || !watched) break;
        gain = clothi_gain(s, h, before, was, &most);
        most = (last ? CLOTHI_GROWN : CLOTHI_GROWTH) * most + s->total * least * least;
        if (!(gain > most) || (s->calm && s->report.outcome == CLOTH_STEP_CONVERGED) ||
            (!bdf2 && (last || s->finish)))
            break;
        if (s->finish) {                    /* v is that of BDF2, whose history stays for a tape */
            s->still = s->h_prev = 0;
            break;
        }
        if (last) {
            s->report.outcome = CLOTH_STEP_STALLED;
            return clothi_fail(&s->hooks, CLOTH_ERR_STEP, "step: %g J came from nowhere: "
                               "a shorter h?", gain);
        }
        clothi_put_back(s, NULL);
        memset(&s->report.energy, 0, sizeof s->report.energy);
        s->report.substeps = s->report.restarts = 0;
    }
    return status;
}

/* Everything around a step, or statics where h = 0: checks, the copy, the ledger, roll-back. */
static cloth_status clothi_guarded(cloth_sim *s, double h, cloth_report *wanted) {
    const double start = clothi_now(&s->hooks);
    long long    allocations = s->allocations;
    int          known = s->known && !s->nattach, contacts = 0, news;
    cloth_report *report = &s->report;
    cloth_ledger before;
    cloth_status status;
    memset(report, 0, sizeof *report);
    memset(&before, 0, sizeof before);
    memset(&s->own.counts, 0, sizeof s->own.counts);
    memset(&s->ms, 0, sizeof s->ms);
    s->charged = &s->ms.other, s->since = start;
    s->known = s->fresh = s->finish = s->calm = 0;
    report->h = h, report->vertex = report->min_stretch_face = -1;
    status = clothi_check_step(s);
    if (!status) status = clothi_need_work(s);
    if (!status) status = clothi_keep(s);
    if (!status) {
        clothi_input(s, 0, 0, 0);           /* at the step's start */
        s->asleep = h > 0 && clothi_sleeps(s);
        s->balance = wanted || clothi_watched(s, h);
        news = s->balance && !(s->asleep && s->rested.outcome);
        if (wanted && !news) *report = s->rested, report->h = h;
        if (news) status = clothi_energy_before(s, known, &before);
        if (!status) status = news ? clothi_booked(s, h, &before) : clothi_step_run(s, h);
        if (!status && s->recorder.step) status = clothi_record_need(s, &contacts);
        if (!status && wanted) clothi_report_state(s, news);
        if (status) {
            clothi_put_back(s, report);
            if (status != CLOTH_ERR_STEP) report->outcome = CLOTH_STEP_NONE;
        } else {
            clothi_accept(s);
            if (news && s->asleep) s->rested = *report;
            if (s->recorder.step) clothi_record_give(s, h, contacts);
        }
    }
    (void)clothi_charge(s, &s->ms.other);
    s->own.counts.allocations = s->allocations - allocations;
    s->ms.total = 1e3 * (s->since - start);
    report->counts = s->own.counts, report->ms = s->ms, report->status = status;
    if (wanted) *wanted = *report;
    return status;
}

/* The answer to a call that was refused before anything was looked at. */
static cloth_status clothi_refused(cloth_report *report, cloth_status status) {
    if (!report) return status;
    memset(report, 0, sizeof *report);
    report->status = status, report->vertex = report->min_stretch_face = -1;
    return status;
}

CLOTH_API cloth_status cloth_step(cloth_sim *sim, double h, cloth_report *report) {
    cloth_status status;
    if (!sim) return clothi_refused(report, CLOTH_ERR_ARGUMENT);
    status = clothi_check_range(&sim->hooks, "cloth_step: ", "h", h, 0, HUGE_VAL, CLOTHI_OVER);
    return status ? clothi_refused(report, status) : clothi_guarded(sim, h, report);
}

CLOTH_API cloth_status cloth_solve_static(cloth_sim *sim, cloth_report *report) {
    if (!sim) return clothi_refused(report, CLOTH_ERR_ARGUMENT);
    if (sim->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG)
        return clothi_refused(report, clothi_fail(&sim->hooks, CLOTH_ERR_UNSUPPORTED,
                                  "cloth_solve_static needs a matrix: LEAPFROG has none"));
    return clothi_guarded(sim, 0, report);
}

CLOTH_API cloth_status cloth_sim_energy(cloth_sim *sim, cloth_ledger *ledger) {
    cloth_ledger l;
    cloth_status status;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!ledger) return clothi_null(&sim->hooks, "cloth_sim_energy: ledger");
    memset(&l, 0, sizeof l);
    status = clothi_check_state(sim);
    if (!status) status = clothi_need_work(sim);
    clothi_input(sim, 0, 0, 0);
    if (!status) status = clothi_energy_at(sim, sim->state.x, sim->state.v, 0, &l);
    if (!status && !clothi_finite(l.total))
        status = clothi_fail(&sim->hooks, CLOTH_ERR_NONFINITE, "cloth_sim_energy: total = %g",
                             l.total);
    if (status) memset(&l, 0, sizeof l);
    *ledger = l;
    return status;
}

CLOTH_API cloth_status cloth_sim_potential(cloth_sim *sim, const double *x, double *energy,
                                           double *grad) {
    clothi_goal  goal;
    cloth_status status;
    double       value;
    int          n;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!x) return clothi_null(&sim->hooks, "cloth_sim_potential: x");
    n = 3 * sim->model->nv;
    status = clothi_check_vector(&sim->hooks, "cloth_sim_potential: x", x, n);
    if (!status) status = clothi_check_state(sim);
    if (!status) status = clothi_need_work(sim);
    if (status) return status;
    clothi_input(sim, 0, 1, 1);
    clothi_eval_start(sim, &goal, 0);
    status = clothi_terms_some(sim, &goal.e, 0, sim->nterms);
    if (!status) status = clothi_objective(sim, &goal, x, sim->w.grad, 0, 0, &value);
    if (!status) status = clothi_check_terms(sim, value);
    if (status) return status;
    if (energy) *energy = value;
    if (grad) memcpy(grad, sim->w.grad, (size_t)n * sizeof(double));
    return CLOTH_OK;
}

/* ===== [10.1] RUN-TIME CONTROL =============================================================== */

CLOTH_API cloth_status cloth_sim_save_obj(const cloth_sim *sim, const char *path) {
    cloth_mesh mesh;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    memset(&mesh, 0, sizeof mesh);
    mesh.nv = sim->model->nv, mesh.x = sim->state.x;
    mesh.nf = sim->model->nf, mesh.faces = sim->model->faces;
    return cloth_obj_save(&sim->model->hooks, path, &mesh);
}

CLOTH_API cloth_state *cloth_sim_state(cloth_sim *sim) { return sim ? &sim->state : NULL; }

CLOTH_API const cloth_model *cloth_sim_model(const cloth_sim *sim) {
    return sim ? sim->model : NULL;
}

CLOTH_API void cloth_sim_state_changed(cloth_sim *sim) { if (sim) clothi_forget(sim); }

CLOTH_API cloth_status cloth_sim_reset(cloth_sim *sim) {
    if (!sim) return CLOTH_ERR_ARGUMENT;
    clothi_sim_start(sim);
    if (sim->contact_on && sim->contact.reset) sim->contact.reset(sim->contact.user);
    return CLOTH_OK;
}

/* Whose pin that of a vertex is: of a follower its leader's. */
static int clothi_leader(const cloth_model *m, int vertex, int axis) {
    return m->tie && m->tie[3 * vertex + axis] >= 0 ? m->tie[3 * vertex + axis] : vertex;
}

static cloth_status clothi_check_pin(const cloth_sim *s, const char *call, int vertex) {
    if (!s) return CLOTH_ERR_ARGUMENT;
    return clothi_check_count(&s->hooks, call, "vertex", vertex, 0, s->model->nv - 1);
}

CLOTH_API cloth_status cloth_sim_pin(cloth_sim *sim, int vertex, unsigned axes,
                                     const double target[3]) {
    unsigned char pin;
    double        to;
    int           k;
    cloth_status  status = clothi_check_pin(sim, "cloth_sim_pin: ", vertex);
    if (!status) status = clothi_check_count(&sim->hooks, "cloth_sim_pin: ", "axes", (int)axes, 1,
                                             CLOTH_AXIS_ALL);
    if (status) return status;
    for (k = 0; k < 3; k++) {
        to = target ? target[k] : sim->state.x[3 * clothi_leader(sim->model, vertex, k) + k];
        if ((axes >> k & 1) && !clothi_finite(to))
            return clothi_fail(&sim->hooks, CLOTH_ERR_NONFINITE, "cloth_sim_pin: target[%i] = %g",
                               k, to);
    }
    for (k = 0; k < 3; k++) {
        const int v = clothi_leader(sim->model, vertex, k);
        if (!(axes >> k & 1)) continue;
        to = target ? target[k] + (sim->model->x[3 * v + k] - sim->model->x[3 * vertex + k])
                    : sim->state.x[3 * v + k];
        clothi_set(sim, sim->target + 3 * v + k, &to, sizeof to);
        pin = (unsigned char)(sim->pin[v] | 1u << k);
        clothi_set(sim, sim->pin + v, &pin, 1);
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_sim_unpin(cloth_sim *sim, int vertex) {
    unsigned char pin;
    int           k;
    cloth_status  status = clothi_check_pin(sim, "cloth_sim_unpin: ", vertex);
    for (k = 0; k < 3 && !status; k++) {
        const int v = clothi_leader(sim->model, vertex, k);
        pin = (unsigned char)(sim->pin[v] & ~(1u << k));
        clothi_set(sim, sim->pin + v, &pin, 1);
    }
    return status;
}

/* Slot + 1 in the low half, generation in the high; 0 is none. */
static cloth_attachment clothi_attachment_id(const cloth_sim *s, int slot) {
    cloth_attachment id;
    id.id = (uint64_t)s->made[slot] << 32 | (uint32_t)(slot + 1);
    return id;
}

/* An attachment, or NULL. */
static cloth_step_attachment *clothi_attached(cloth_sim *s, cloth_attachment id, const char *call) {
    const uint32_t at = (uint32_t)id.id - 1u;
    if (at < (uint32_t)s->model->desc.max_attachments && s->attach[at].used &&
        s->made[at] == id.id >> 32)
        return s->attach + at;
    (void)clothi_fail(&s->hooks, CLOTH_ERR_HANDLE, "%s: attachment %z is gone", call,
                      (size_t)id.id);
    return NULL;
}

/* goal: the target; of `on` the point `at` of the face `other`. */
static cloth_status clothi_attach_add(cloth_sim *s, int face, const double *bary, double k, int on,
                                      int other, const double *goal, cloth_attachment *id) {
    cloth_step_attachment q = {1, face, {0, 0, 0}, k, {0, 0, 0}, {0, 0, 0}, on, other, {0, 0, 0}};
    cloth_status          status;
    double                w[6];
    int                   i, v[6];
    if (id) id->id = 0;
    if (!s) return CLOTH_ERR_ARGUMENT;
    if (!id) return clothi_null(&s->hooks, "attachment: id");
    for (i = 0; i < 2; i++) {
        const char   *name = !i ? "attachment: bary" : on ? "attachment: at" : "attachment: target";
        const double *p = i ? goal : bary;
        const int     f = i ? other : face, nf = s->model->nf;
        if (!p) return clothi_null(&s->hooks, name);
        if ((!i || on < 0) && (f < 0 || f >= nf || (i && f == face)))
            return clothi_fail(&s->hooks, CLOTH_ERR_ARGUMENT, i ? "attachment: other face %i but nf"
                               " = %i, face %i" : "attachment: face %i but nf = %i", f, nf, face);
        status = clothi_check_vector(&s->hooks, name, p, 3);
        if (status) return status;
        if ((!i || on) && fabs(p[0] + p[1] + p[2] - 1) > 1e-6)
            return clothi_fail(&s->hooks, CLOTH_ERR_ARGUMENT, "%s sums to %g, not 1", name,
                               p[0] + p[1] + p[2]);
        memcpy(!i ? q.bary : on ? q.at : q.target, p, sizeof q.at);
    }
    status = clothi_check_range(&s->hooks, "attachment: ", "k", k, 0, HUGE_VAL, 0);
    if (status) return status;
    for (i = 0; i < s->model->desc.max_attachments && s->attach[i].used; i++) {}
    if (i == s->model->desc.max_attachments)
        return clothi_fail(&s->hooks, CLOTH_ERR_CAPACITY,
                           "attachment: desc.max_attachments = %i are in use", i);
    (void)clothi_attach_gap(s->model, NULL, &q, s->state.x, v, w, q.pose);  /* without a jerk */
    status = clothi_check_vector(&s->hooks, "attachment: state.x at the face", q.pose, 3);
    if (status) return status;
    clothi_set(s, s->attach + i, &q, sizeof q);
    s->made[i] = ++s->generation;
    s->nattach++;
    *id = clothi_attachment_id(s, i);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_sim_attach(cloth_sim *sim, int face, const double bary[3], double k,
                                        const double target[3], cloth_attachment *id) {
    return clothi_attach_add(sim, face, bary, k, 0, 0, target, id);
}

CLOTH_API cloth_status cloth_sim_stitch(cloth_sim *sim, int face, const double bary[3], double k,
                                        int other, const double at[3], cloth_attachment *id) {
    return clothi_attach_add(sim, face, bary, k, -1, other, at, id);
}

CLOTH_API cloth_status cloth_sim_attach_move(cloth_sim *sim, cloth_attachment id,
                                             const double target[3]) {
    cloth_step_attachment *q;
    cloth_status           status;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!target) return clothi_null(&sim->hooks, "cloth_sim_attach_move: target");
    q = clothi_attached(sim, id, "cloth_sim_attach_move");
    if (!q) return CLOTH_ERR_HANDLE;
    status = clothi_check_vector(&sim->hooks, "cloth_sim_attach_move: target", target, 3);
    if (status) return status;
    memcpy(q->target, target, sizeof q->target);
    if (q->on > 0) q->on = 0;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_sim_detach(cloth_sim *sim, cloth_attachment id) {
    cloth_step_attachment *q;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    q = clothi_attached(sim, id, "cloth_sim_detach");
    if (!q) return CLOTH_ERR_HANDLE;
    memset(q, 0, sizeof *q);
    sim->nattach--;
    sim->still = 0;
    return CLOTH_OK;
}

/* An input of n numbers, checked; none switches *on off, which may be NULL where there are some. */
static cloth_status clothi_set_input(cloth_sim *s, const char *name, double *to, const double *from,
                                     int n, int *on) {
    const int          given = from != NULL;
    const cloth_status status = clothi_check_vector(&s->hooks, name, from, n);
    if (!status && from) clothi_set(s, to, from, (size_t)n * sizeof *to);
    if (!status && on) clothi_set(s, on, &given, sizeof given);
    return status;
}

CLOTH_API cloth_status cloth_sim_set_force(cloth_sim *sim, const double *f) {
    cloth_status status;
    size_t       n;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    n = 3 * (size_t)sim->model->nv;
    status = f ? clothi_need(sim, &sim->force, n) : CLOTH_OK;
    if (status) return status;
    if (!f && sim->force) memset(sim->force, 0, n * sizeof(double));
    return clothi_set_input(sim, "cloth_sim_set_force: f", sim->force, f, (int)n, &sim->force_on);
}

CLOTH_API cloth_status cloth_sim_set_gravity(cloth_sim *sim, const double g[3]) {
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!g) return clothi_null(&sim->hooks, "cloth_sim_set_gravity: g");
    sim->known = 0;
    return clothi_set_input(sim, "cloth_sim_set_gravity: g", sim->gravity, g, 3, NULL);
}

CLOTH_API cloth_status cloth_sim_set_wind(cloth_sim *sim, const double w[3]) {
    if (!sim) return CLOTH_ERR_ARGUMENT;
    return clothi_set_input(sim, "cloth_sim_set_wind: w", sim->wind, w, 3, &sim->wind_on);
}

CLOTH_API cloth_status cloth_sim_set_material(cloth_sim *sim, int region, const cloth_material *m) {
    cloth_material old;
    cloth_status   status;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!m) return clothi_null(&sim->hooks, "cloth_sim_set_material: m");
    status = clothi_check_count(&sim->hooks, "cloth_sim_set_material: ", "region", region, 0,
                                sim->model->nregions - 1);
    if (status) return status;
    old = sim->params.material[region], sim->params.material[region] = *m;
    status = clothi_check_params(sim, &sim->params);
    if (status) sim->params.material[region] = old;
    if (status) return status;
    clothi_derive(sim);
    if (old.plane != m->plane || memcmp(&old, m, offsetof(cloth_material, plane)))
        clothi_forget(sim);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_sim_add_term(cloth_sim *sim, const cloth_term *term) {
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!term || !term->eval)
        return clothi_null(&sim->hooks, term ? "cloth_sim_add_term: eval"
                                             : "cloth_sim_add_term: term");
    if ((term->save || term->load || term->save_size) &&
        !(term->save && term->load && term->save_size))
        return clothi_fail(&sim->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_sim_add_term: set save_size, save and load, or none");
    if (!(term->stiffness >= 0 && clothi_finite(term->stiffness)))
        return clothi_fail(&sim->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_sim_add_term: stiffness = %g", term->stiffness);
    if (sim->nterms == CLOTHI_MAX_TERMS)
        return clothi_fail(&sim->hooks, CLOTH_ERR_CAPACITY, "cloth_sim_add_term: %i terms at most",
                           CLOTHI_MAX_TERMS - sim->nbuiltin);
    sim->term[sim->nterms++] = *term;
    sim->known = 0, sim->still = 0;
    if (sim->tape_gone) sim->recorder.step(sim->recorder.user, NULL);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_sim_set_contact(cloth_sim *sim, const cloth_contact *contact) {
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (contact && (!contact->begin || !contact->start || !contact->update || !contact->eval ||
                    !contact->max_step || !contact->close || !contact->resolve ||
                    !contact->commit))
        return clothi_null(&sim->hooks, "cloth_sim_set_contact: begin, start, update, eval, "
                                        "max_step, close, resolve or commit");
    if (sim->contact_on && sim->contact.orphan) sim->contact.orphan(sim->contact.user);
    sim->contact_on = contact != NULL, sim->still = 0;
    if (contact) sim->contact = *contact;
    return CLOTH_OK;
}

/* ===== [10.2] SNAPSHOT =======================================================================
 *
 *   [ magic | version | bytes | checksum | hashes of the model | clothi_fields ... units ]
 *
 * checked: tests/test_snapshot.c, tests/test_record.c
 */

#define CLOTHI_MAGIC 0x706e536874306c43u    /* "Cl0thSnp" */

typedef struct clothi_snapshot_head {
    uint64_t magic, version, bytes, checksum, aspect[CLOTHI_ASPECTS];
} clothi_snapshot_head;

CLOTH_API size_t cloth_sim_save_size(const cloth_sim *sim) {
    return sim ? clothi_walked(sim, CLOTHI_SIZE, NULL, 0, CLOTHI_MAX_TERMS) +
                     sizeof(clothi_snapshot_head)
               : 0;
}

CLOTH_API cloth_status cloth_sim_save(const cloth_sim *sim, void *buf, size_t size) {
    clothi_snapshot_head head;
    unsigned char       *data = (unsigned char *)buf + sizeof head;
    size_t               need;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!buf) return clothi_null(&sim->hooks, "cloth_sim_save: buf");
    need = cloth_sim_save_size(sim);
    if (size < need)
        return clothi_fail(&sim->hooks, CLOTH_ERR_CAPACITY,
                           "cloth_sim_save: %z bytes given, %z needed", size, need);
    (void)clothi_walked(sim, CLOTHI_SAVE, data, 0, CLOTHI_MAX_TERMS);
    head.magic = CLOTHI_MAGIC, head.version = CLOTH_VERSION_NUM, head.bytes = need;
    memcpy(head.aspect, sim->model->aspect, sizeof head.aspect);
    head.checksum = clothi_hash(0xcbf29ce484222325u, data, need - sizeof head);
    memcpy(buf, &head, sizeof head);
    return CLOTH_OK;
}

/* The units of a snapshot, from byte `at` of the walk on, are this sim's, and end with it. */
static cloth_status clothi_check_units(const cloth_sim *sim, const char *call,
                                       const unsigned char *buf, size_t at, size_t end) {
    cloth_term   u;
    cloth_status status = CLOTH_OK;
    uint64_t     head[2];
    int          i;
    for (i = 0; clothi_unit_at(sim, i, &u); i++) {
        at += CLOTHI_PAD8(at);
        if (at > end || end - at < sizeof head) break;
        memcpy(head, buf + at, sizeof head);
        at += sizeof head;
        if (head[0] != clothi_unit_id(&u) || head[1] > end - at || (head[1] > 0 && !u.load))
            return clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT, "%s: the state of the host's term "
                               "%i is not in the snapshot", call, i);
        if (sim->nbuiltin + i == sim->nterms && sim->contact.check)
            status = sim->contact.check(u.user, buf + at, (size_t)head[1]);
        if (status) return status;
        at += (size_t)head[1];
    }
    if (at == end && !clothi_unit_at(sim, i, &u)) return CLOTH_OK;
    return clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT,
                       "%s: the snapshot has other host's terms, or contact, than this sim", call);
}

/* The field that no call would have left so, or NULL. */
static const char *clothi_forged_field(const cloth_sim *s) {
    size_t f;
    int    i, used = 0;
    for (f = 0; f < CLOTHI_FIELDS; f++) {
        const clothi_field *q = clothi_fields + f;
        const double       *a = (const double *)(void *)clothi_field_data(s, q);
        if (q->flags & CLOTHI_REAL &&
            clothi_find_nonfinite(a, clothi_field_count(s, q) * (q->size / sizeof *a)) >= 0)
            return q->name;
    }
    if (s->history >> 1 || s->force_on >> 1 || s->wind_on >> 1 || s->params.mass_given >> 1)
        return "history, force_on, wind_on or mass_given";
    if (s->h_prev < 0 || s->still < 0 || !(s->fraction > 0 && s->fraction <= 1))
        return "h_prev, still or fraction";
    for (i = 0; i < s->model->nv; i++)
        if (s->pin[i] > CLOTH_AXIS_ALL) return "pin";
    for (i = 0; i < s->model->desc.max_attachments; used += s->attach[i++].used) {
        const cloth_step_attachment *q = s->attach + i;
        if (q->used >> 1 || q->face < 0 || q->face >= s->model->nf || !clothi_finite(q->k) ||
            q->k < 0 || q->on < -1 || q->other < 0 || (q->on < 0 && q->other >= s->model->nf) ||
            clothi_find_nonfinite(q->bary, 3) >= 0 || clothi_find_nonfinite(q->at, 3) >= 0 ||
            clothi_find_nonfinite(q->pose, 3) >= 0 || clothi_find_nonfinite(q->target, 3) >= 0)
            return "attachment";
    }
    return s->nattach == used ? NULL : "nattach";
}

/* Fields but for those of `skip` and units from [bytes] of buf, if they may be; all is as before
 * when not. */
static cloth_status clothi_load(cloth_sim *s, const void *buf, size_t bytes, int skip) {
    const size_t fields = clothi_walked(s, CLOTHI_SIZE, NULL, skip, 0);
    cloth_status status = clothi_check_units(s, "cloth_sim_restore", (const unsigned char *)buf,
                                             fields, bytes);
    const char  *forged;
    int          i;
    if (!status) status = clothi_fields_need(s, 0);
    if (!status) status = clothi_room(s, &s->kept, fields, 0);
    if (status) return status;
    (void)clothi_walked(s, CLOTHI_SAVE, s->kept, skip, 0);
    (void)clothi_walked(s, CLOTHI_LOAD, buf, skip, 0);
    forged = clothi_forged_field(s);
    if (forged)
        status = clothi_fail(&s->hooks, CLOTH_ERR_FORMAT, "cloth_sim_restore: no sim would have "
                             "saved such a %s", forged);
    else if (clothi_check_params(s, &s->params))
        status = CLOTH_ERR_FORMAT;
    (void)clothi_walked(s, CLOTHI_LOAD, status ? s->kept : buf, skip,
                        status ? 0 : CLOTHI_MAX_TERMS);
    for (i = 0; i < s->model->desc.max_attachments; i++)
        if (s->made[i] > s->generation) s->generation = s->made[i];
    s->known = 0, s->rested.outcome = CLOTH_STEP_NONE;
    return status;
}

CLOTH_API cloth_status cloth_sim_restore(cloth_sim *sim, const void *buf, size_t size) {
    const unsigned char *data;
    clothi_snapshot_head head;
    cloth_status         status;
    int                  i;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!buf) return clothi_null(&sim->hooks, "cloth_sim_restore: buf");
    memset(&head, 0, sizeof head);
    if (size >= sizeof head) memcpy(&head, buf, sizeof head);
    if (head.magic != CLOTHI_MAGIC || head.version != CLOTH_VERSION_NUM)
        return clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT,
                           "cloth_sim_restore: not a snapshot of this version");
    for (i = 0; i < CLOTHI_ASPECTS; i++)
        if (head.aspect[i] != sim->model->aspect[i])
            return clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT, "cloth_sim_restore: the snapshot is "
                               "of another model, with another %s", clothi_aspects[i]);
    if (head.bytes > size || head.bytes < sizeof head)
        return clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT,
                           "cloth_sim_restore: %z bytes given, not those of the snapshot", size);
    data = (const unsigned char *)buf + sizeof head, size = (size_t)head.bytes - sizeof head;
    if (clothi_hash(0xcbf29ce484222325u, data, size) != head.checksum)
        return clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT,
                           "cloth_sim_restore: the checksum does not match");
    status = clothi_load(sim, data, size, 0);
    if (!status) clothi_derive(sim);
    return status;
}

/* --- records --- */

CLOTH_API cloth_status cloth_sim_set_recorder(cloth_sim *sim, const cloth_recorder *recorder) {
    cloth_recorder *to;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    to = sim->tape_gone ? &sim->host : &sim->recorder;
    memset(to, 0, sizeof *to);
    if (recorder) *to = *recorder;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_step_replay(cloth_sim *sim, const cloth_step_record *record,
                                         cloth_report *report) {
    cloth_status status = CLOTH_ERR_ARGUMENT;
    if (sim && !record) status = clothi_null(&sim->hooks, "cloth_step_replay: record");
    else if (sim && record->model != sim->model->hash)
        status = clothi_fail(&sim->hooks, CLOTH_ERR_FORMAT,
                             "cloth_step_replay: the record is of another model");
    else if (sim && (!record->state || !(record->h >= 0 && clothi_finite(record->h))))
        status = clothi_fail(&sim->hooks, CLOTH_ERR_ARGUMENT, "cloth_step_replay: record->state is "
                             "NULL or h = %g", record->h);
    else if (sim) status = clothi_load(sim, record->state, record->bytes, CLOTHI_PARAM);
    if (status) return clothi_refused(report, status);
    return record->h > 0 ? cloth_step(sim, record->h, report) : cloth_solve_static(sim, report);
}

CLOTH_API uint64_t cloth_sim_hash(const cloth_sim *sim) {
    clothi_walk w;
    if (!sim) return 0;
    memset(&w, 0, sizeof w);
    w.verb = CLOTHI_HASH, w.hash = 0xcbf29ce484222325u ^ sim->model->hash;
    clothi_walk_fields(sim, &w);
    clothi_walk_units(sim, &w, CLOTHI_MAX_TERMS);
    return w.lost ? 0 : w.hash;
}

CLOTH_API uint64_t cloth_model_hash(const cloth_model *model) { return model ? model->hash : 0; }

/* ===== [10.3] QUERIES ======================================================================== */

CLOTH_API const cloth_topology *cloth_model_topology(const cloth_model *model) {
    return model ? model->topology : NULL;
}

CLOTH_API double cloth_model_blocks_per_row(const cloth_model *model) {
    const cloth_pattern *p = model ? model->pattern : NULL;
    return p ? 1 + 2.0 * p->nlow / p->n : 0;
}

/* Area-weighted normal of vertex i: the sum of its faces' cross products. */
CLOTHI_OUTLINE static void clothi_vertex_normal(const cloth_sim *s, int i, double *n) {
    const cloth_topology *t = s->model->topology;
    double                c[3], len;
    int                   k;
    n[0] = n[1] = n[2] = 0;
    for (k = t->vf_start[i]; k < t->vf_start[i + 1]; k++) {
        clothi_face_cross(s->state.x, s->model->faces + 3 * t->vf[k], c);
        n[0] += c[0], n[1] += c[1], n[2] += c[2];
    }
    len = sqrt(clothi_dot3(n, n));
    for (k = 0; k < 3; k++) n[k] = len > 0 ? n[k] / len : k == 1 ? 1.0 : 0.0;
}

CLOTH_API cloth_status cloth_sim_vertices_f32(const cloth_sim *sim, const double origin[3],
                                              float *pos, float *nrm, size_t stride) {
    int i, k;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (origin && clothi_check_vector(&sim->hooks, "cloth_sim_vertices_f32: origin", origin, 3))
        return CLOTH_ERR_NONFINITE;
    if (stride == 0) stride = 3 * sizeof(float);
    if (stride < 3 * sizeof(float))
        return clothi_fail(&sim->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_sim_vertices_f32: stride = %z bytes is below 12", stride);
    for (i = 0; i < sim->model->nv; i++) {
        float  out[3];
        double n[3];
        for (k = 0; pos && k < 3; k++)
            out[k] = (float)(sim->state.x[3 * i + k] - (origin ? origin[k] : 0.0));
        if (pos) memcpy((char *)pos + (size_t)i * stride, out, sizeof out);
        if (!nrm) continue;
        clothi_vertex_normal(sim, i, n);
        for (k = 0; k < 3; k++) out[k] = (float)n[k];
        memcpy((char *)nrm + (size_t)i * stride, out, sizeof out);
    }
    return CLOTH_OK;
}

/* Ray o + t d, d not 0, against the face v [3] of x, seen along d: p_k is where corner k is in the
 * plane across from the largest component of d,
 *   w_2 = p_0 x p_1, and so on around; bary = w / sum w.
 * All of one sign: hit. p is the same for every face at a vertex, and an edge's w exactly the
 * negative of what the face beyond it gets: no ray slips through between faces. */
static int clothi_ray_face(const double *o, const double *d, const double *x, const int *v,
                           double *t, double *bary) {
    double p[6], r[3], away[3], sum, at = 0;
    int    k, j, z = fabs(d[1]) > fabs(d[0]);
    if (fabs(d[2]) > fabs(d[z])) z = 2;
    for (k = 0; k < 3; k++) {
        clothi_sub3(x + 3 * v[k], o, r);
        away[k] = r[z] / d[z];
        for (j = 0; j < 2; j++) p[2 * k + j] = r[(z + 1 + j) % 3] - away[k] * d[(z + 1 + j) % 3];
    }
    for (k = 0; k < 3; k++) {
        const double *a = p + 2 * ((k + 1) % 3), *b = p + 2 * ((k + 2) % 3);
        bary[k] = a[0] * b[1] - a[1] * b[0];
    }
    if ((bary[0] < 0 || bary[1] < 0 || bary[2] < 0) && (bary[0] > 0 || bary[1] > 0 || bary[2] > 0))
        return 0;
    sum = bary[0] + bary[1] + bary[2];
    if (!(fabs(sum) > 0)) return 0;
    for (k = 0; k < 3; k++) {
        bary[k] /= sum;
        at += bary[k] * away[k];
    }
    *t = at;
    return at >= 0;
}

CLOTH_API int cloth_sim_ray(const cloth_sim *sim, const double o[3], const double d[3],
                            double *t, int *face, double bary[3]) {
    double best = HUGE_VAL, at, b[3], u[3];
    int    f, k, hit = -1, e;
    if (!sim || !o || !d) return 0;
    if (clothi_find_nonfinite(o, 3) >= 0 || clothi_find_nonfinite(d, 3) >= 0) return 0;
    if (!(clothi_max_abs(d, 3) > 0)) return 0;
    (void)frexp(clothi_max_abs(d, 3), &e);
    for (k = 0; k < 3; k++) u[k] = ldexp(d[k], -e);     /* near 1 */
    for (f = 0; f < sim->model->nf; f++) {
        if (!clothi_ray_face(o, u, sim->state.x, sim->model->faces + 3 * f, &at, b) ||
            !(at < best))
            continue;
        best = at;
        hit = f;
        if (bary) memcpy(bary, b, sizeof b);
    }
    if (hit < 0) return 0;
    if (t) *t = ldexp(best, -e);
    if (face) *face = hit;
    return 1;
}

CLOTH_API cloth_status cloth_sim_stretches(const cloth_sim *sim, double *smallest,
                                           double *largest) {
    int f;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    for (f = 0; f < sim->model->nf; f++) {
        double corners[9], stretch[2];
        (void)clothi_face_stretch(sim, sim->state.x, f, stretch, corners);
        if (smallest) smallest[f] = stretch[1];
        if (largest) largest[f] = stretch[0];
    }
    return CLOTH_OK;
}

/* Faces by stretch (blue: short, red: long), pins, attachments, normals. */
CLOTH_API void cloth_debug_draw_state(const cloth_sim *sim, const cloth_debug_draw *draw) {
    const cloth_model *m;
    int                f, i, k;
    if (!sim || !draw) return;
    m = sim->model;
    for (f = 0; draw->triangle && f < m->nf; f++) {
        double   corners[9], stretch[2];
        unsigned hot, cold;
        (void)clothi_face_stretch(sim, sim->state.x, f, stretch, corners);
        hot = (unsigned)(255 * fmin(fmax(stretch[0] - 1, 0) * 10, 1));
        cold = (unsigned)(255 * fmin(fmax(1 - stretch[1], 0) * 10, 1));
        draw->triangle(corners, corners + 3, corners + 6,
                       (255u - cold) << 16 | (255u - (hot > cold ? hot : cold)) << 8 |
                           (255u - hot), draw->user);
    }
    for (i = 0; i < m->nv; i++) {
        const double *x = sim->state.x + 3 * i;
        double        n[3], tip[3];
        if (draw->point && sim->pin[i]) draw->point(x, 6, 0xff0000u, draw->user);
        if (!draw->line) continue;
        clothi_vertex_normal(sim, i, n);
        for (k = 0; k < 3; k++) tip[k] = x[k] + 0.01 * n[k];
        draw->line(x, tip, 0x00a000u, draw->user);
    }
    for (i = 0; sim->nattach > 0 && i < m->desc.max_attachments; i++) {
        cloth_step_attachment q = sim->attach[i];
        double                p[3], end[3], w[6];
        int                   v[6], n = clothi_attach_gap(m, NULL, &q, sim->state.x, v, w, end);
        q.on = 0;
        if (!clothi_attach_gap(m, NULL, &q, sim->state.x, v, w, p)) continue;
        for (k = 0; k < 3; k++) end[k] = n > 3 ? p[k] - end[k] : q.target[k];
        if (draw->line) draw->line(p, end, 0xff8000u, draw->user);
        if (draw->text) draw->text(end, "attachment", 0xff8000u, draw->user);
    }
}

/* ===== [10.4] ADVICE =========================================================================
 *
 *   symbols    rho kg/m^2, Y N/m (membrane), D N m: Y/rho and D/rho the largest of any region;
 *              L extent m, g m/s^2, e edge m of equilateral triangles of the mean size
 *   groups     rho g L^3 / D        gravity against bending: above ~1000 a membrane alone is
 *                                   within 5 % of L of the elastica; below ~1.5 all is linear
 *              h omega_m            omega_m = 2 sqrt(2 Y/rho)/e, the stiffest membrane mode:
 *                                   below 2 an explicit step is stable
 *              h omega_b            omega_b = 8 sqrt(D/rho)/(sqrt(3/4) e^2), the stiffest bending
 *                                   mode of a grid of squares of the same area
 *              sqrt(2 g L) h / e    edges that a falling corner crosses in a step
 *              (h omega_1)^2        energy that implicit Euler takes a step from the slowest
 *                                   swing, omega_1 = sqrt(g/L)
 *
 * The rung that each implies is a rule of thumb from these groups alone, not a simulation.
 * checked: tests/test_advise.c
 */

typedef struct clothi_scene {               /* what the groups are made of                     */
    double Y, D, L, edge, g, tau;           /* Y, D: over rho                                  */
} clothi_scene;

static void clothi_scene_of(const cloth_desc *desc, clothi_scene *scene) {
    const cloth_material *mat = desc->nregions > 0 ? desc->materials : &desc->material;
    const int nregions = desc->nregions > 0 ? desc->nregions : 1;
    double    area = 0, n[3];
    int       i;
    for (i = 0; i < desc->nf; i++) {
        clothi_face_cross(desc->x_rest, desc->faces + 3 * i, n);
        area += desc->X ? clothi_rest_area(desc->X, i) : 0.5 * sqrt(clothi_dot3(n, n));
    }
    scene->Y = scene->D = scene->tau = 0;
    for (i = 0; i < nregions; i++, mat++) {
        scene->Y = clothi_max(scene->Y, clothi_young(mat) / mat->density);
        scene->D = clothi_max(scene->D, cloth_material_rigidity(mat) / mat->density);
        scene->tau = clothi_max(scene->tau, mat->damping);
    }
    scene->g = sqrt(clothi_dot3(desc->gravity, desc->gravity));
    scene->edge = sqrt(4 / sqrt(3.0) * area / desc->nf);
    scene->L = clothi_extent(desc->x_rest, desc->nv);
}

/* The rungs that the groups imply; swing = sqrt(g/L), 1/s. */
static void clothi_advise_rungs(const cloth_desc *desc, const clothi_scene *sc, double swing,
                                double h, double tolerance, cloth_advice *advice) {
    advice->membrane = tolerance > 0.02 * sc->L ? CLOTH_MEMBRANE_SPRINGS : CLOTH_MEMBRANE_STVK;
    /* what bending moves at the edge of a fold is about L (rho g L^3/D)^(-1/3) long */
    if (!(sc->D > 0) || pow(advice->gravity_bending, -1.0 / 3) * sc->L < 0.1 * tolerance)
        advice->bend = CLOTH_BEND_NONE;
    else if (tolerance > 0.01 * sc->L && desc->rest_angle == CLOTH_REST_ANGLE_FLAT)
        advice->bend = CLOTH_BEND_QUADRATIC;
    else
        advice->bend = CLOTH_BEND_HINGE;
    /* a hundred force evaluations cost about what a converged implicit step does */
    if (advice->leapfrog_substeps <= 100)
        advice->integrator = CLOTH_INTEGRATOR_LEAPFROG;
    else if (0.5 * h * swing * sc->L > tolerance)
        advice->integrator = CLOTH_INTEGRATOR_BDF2;
    else
        advice->integrator = CLOTH_INTEGRATOR_EULER;
    advice->contact = desc->contact;
    advice->h = advice->integrator == CLOTH_INTEGRATOR_EULER
                    ? h : fmin(h, sqrt(tolerance / sc->L) / swing);
}

CLOTH_API cloth_status cloth_advise(const cloth_desc *desc, double h, double tolerance,
                                    cloth_advice *advice) {
    clothi_scene sc;
    double       swing, half, z;
    cloth_status status;
    if (advice) memset(advice, 0, sizeof *advice);
    if (!desc) return CLOTH_ERR_ARGUMENT;
    if (desc->cookie != CLOTHI_COOKIE) return advice ? CLOTH_ERR_UNINIT : CLOTH_ERR_ARGUMENT;
    if (!advice) return clothi_null(&desc->hooks, "cloth_advise: advice");
    if (!clothi_finite(h) || !(h > 0) || !clothi_finite(tolerance) || !(tolerance > 0))
        return clothi_fail(&desc->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_advise: h = %g and tolerance = %g must be finite and > 0", h,
                           tolerance);
    status = clothi_check_desc(desc);
    if (status) return status;
    clothi_scene_of(desc, &sc);
    swing = sqrt(sc.g > 0 ? sc.g / sc.L : 1);
    advice->gravity_bending = sc.D > 0 ? sc.g * sc.L * sc.L * sc.L / sc.D : HUGE_VAL;
    advice->step_membrane = h * 2 * sqrt(2 * sc.Y) / sc.edge;
    advice->step_bending = h * 8 * sqrt(sc.D) / (sqrt(0.75) * sc.edge * sc.edge);
    advice->self_reach = sqrt(2 * sc.g * sc.L) * h / sc.edge;
    advice->euler_loss = h * swing * (h * swing);
    half = 0.5 * fmax(advice->step_membrane, advice->step_bending);
    z = sc.tau / h * half;            /* damping: [9.4] */
    advice->leapfrog_substeps =
        (int)fmin(1e9, ceil(half * (sqrt(1 + z * z) + z) / CLOTHI_LEAP_SAFETY));
    clothi_advise_rungs(desc, &sc, swing, h, tolerance, advice);
    return CLOTH_OK;
}

CLOTHI_RARE_END

#ifdef CLOTHI_OWN_SQRT
#  pragma pop_macro("sqrt")
#endif
#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */

/* ===== [11.1] CHANGES AND LICENCE ============================================================
 * Newest first. [api] a call or struct changed, [numbers] results change, [fix] a fault mended.
 * Until 1.0 a minor version may change the interface; a patch changes neither it nor numbers.
 *
 * 0.2.0  [api] cloth_desc_set_mesh(), cloth_log_stderr(), cloth_sim_save_obj(), warnings;
 *        desc.sleep; the cancel hook's answer 2; cloth_term.stiffness; cloth_layer.step; the linear
 *        solver chooses its precision itself; CLOTH_ASSERT, which nothing used, is gone. [numbers]
 *        contact is part of the minimisation; one order of the unknowns for all solvers; Newton's
 *        predicted stress; angles of round meshes. [fix] names that windows.h and complex.h take;
 *        x87 and fast maths are refused; MinGW's sqrt; searches that are cut short; statics that
 *        nothing holds, of many valleys, of what hosts lag; a contact that was taken away; CG asked
 *        for more than rounding leaves; ties in contact; parallel edges; LEAPFROG of larger
 *        patterns, of springs, of pressed plates, in gales, at uneven frames, for long, its
 *        contacts' forces; what turns or carries; what leaves a pinch; hosts' terms in searches
 *        that are cut short, or by walls, and rides; searches of over 400 iterations; what pinches
 *        do is booked; snapshots after an obstacle was put back, or what was attached; replays of
 *        shortened steps. Handles have 64 bits, meshes sizes of 1e-70 to 1e70 m, friction is at
 *        most 1000, a radius 5e5 thicknesses; balls have their equator; model hashes count masses;
 *        cloth_qp_report.refactorizations is gone.
 * 0.1.0  first version: mesh, elements, implicit Euler, BDF2, leapfrog, statics.
 *
 * MIT License
 *
 * Copyright (c) 2026 the clothsim authors
 *
 * Permission is hereby granted, free of charge, to any person obtaining a copy of this software
 * and associated documentation files (the "Software"), to deal in the Software without
 * restriction, including without limitation the rights to use, copy, modify, merge, publish,
 * distribute, sublicense, and/or sell copies of the Software, and to permit persons to whom the
 * Software is furnished to do so, subject to the following conditions:
 *
 * The above copyright notice and this permission notice shall be included in all copies or
 * substantial portions of the Software.
 *
 * THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING
 * BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
 * NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM,
 * DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
 * OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
 */
