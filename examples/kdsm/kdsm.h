/* kdsm.h - cloth described by the space round a body.                             version 0.1.0
 * SPDX-License-Identifier: MIT
 *
 * A tetrahedral mesh fills the air round a skinned body and is skinned with it. A vertex of cloth
 * is told by its place in that mesh at rest: what the pose does to the space it does to the cloth,
 * and what is left (wrinkles, sliding) is a small displacement d at rest, fit to be learned.
 * Built on clothsim.h and clothsim_collide.h, by their public calls. C99, libc and libm only.
 *
 * In ONE .c file:        #define KDSM_IMPLEMENTATION
 *                        #include "kdsm.h"             (the kit's implementation: as ever)
 * everywhere else:       #include "kdsm.h"
 *
 * CONTENTS
 *   read before the first line of your own
 *     [1.1] QUICK START                      [1.2] THE METHOD, AND WHAT IS NOT PROMISED
 *   the interface
 *     [2.1] THE SPACE ROUND A BODY           [2.2] A POSE OF IT
 *     [2.3] CLOTH IN IT
 *   the implementation, bottom-up
 *     [3.1] MEMORY, SENTENCES, SMALL MATHS   [3.2] HIERARCHY OF BOXES
 *     [4.1] LATTICE                          [4.2] RED AND GREEN
 *     [4.3] WEIGHTS                          [4.4] QUALITY
 *     [5.1] THE SPACE                        [5.2] POSES, POINTS IN THEM
 *     [6.1] EMBEDDING                        [6.2] DISPLACEMENTS
 */

/* ===== [1.1] QUICK START =====================================================================
 *
 *     kdsm_desc   desc = kdsm_desc_default();
 *     kdsm_space *space = NULL;
 *     kdsm_pose  *pose = NULL;
 *     kdsm_cloth *cloth = NULL;
 *     desc.nv = .., desc.x = .., desc.nf = .., desc.faces = ..;        // the body at rest, closed
 *     desc.njoints = .., desc.influences = 4, desc.joint = .., desc.weight = ..;
 *     status = kdsm_create(&desc, &space);                              // once per body
 *     status = kdsm_cloth_create(space, nv, u, nf, faces, &cloth);     // once per garment, at rest
 *     status = kdsm_pose_create(space, &pose);
 *     // for each example of training: joints T [njoints x 12], cloth x [nv x 3] as simulated
 *     status = kdsm_pose_set(pose, T);
 *     status = kdsm_displace(cloth, pose, x, &options, d, NULL, &report);
 *     // and back: what a network says d is
 *     status = kdsm_place(cloth, T, d, x, NULL);
 *
 * examples/kdsm/01_table.c runs as it stands.
 */

/* ===== [1.2] THE METHOD, AND WHAT IS NOT PROMISED ============================================
 *
 * After [WGZF20] Wu, Geng, Zhou, Fedkiw: Skinning a Parameterization of Three-Dimensional Space
 * for Neural Network Cloth, arXiv:2006.04874. Mesh: [MBTF03] Molino, Bridson, Teran, Fedkiw: A
 * Crystalline, Red Green Strategy for Meshing Highly Deformable Objects with Tetrahedra, 12th
 * International Meshing Roundtable, 2003.
 *
 *     v_k(T)  = sum_j w_kj T_j v_k               skinning; T_j: from rest to where joint j takes it
 *     u_i     = sum_k L_ik v_k                   embedding at rest, L the barycentric coordinates
 *     um_i    = u_i + d_i = sum_k Lm_ik v_k      displaced at rest, embedded anew
 *     x_i(T)  = sum_k Lm_ik v_k(T)               result
 *     d from x: the deformed tetrahedron that holds x_i, weights Lg_ik: um_i = sum_k Lg_ik v_k
 *
 * x is linear in d in each tetrahedron, dx/du = F, constant there, and continuous in the mesh.
 * Where u + d leaves it, x jumps as another tetrahedron becomes the nearest.
 *
 * NOT PROMISED
 *   - that cloth stays in the mesh: what leaves it at rest goes with the nearest tetrahedron, what
 *     no deformed tetrahedron holds is put where method 2 says; both are counted
 *   - that a pose folds no space: where joints bend, deformed tetrahedra overlap and turn inside
 *     out. One point then has several places at rest; [6.2] is about which one to take
 *   - exact distances beyond the cells of the distance grid: the level set is that of the grid
 *   - bits across compilers, as in the kit; on one binary every result is the same each time
 */

#ifndef KDSM_H
#define KDSM_H

#include "clothsim_collide.h"

#ifdef __cplusplus
extern "C" {
#endif

#ifndef KDSM_API                            /* linkage of the public functions                 */
#  ifdef KDSM_STATIC
#    define KDSM_API static
#  else
#    define KDSM_API extern
#  endif
#endif

/* ===== [2.1] THE SPACE ROUND A BODY ========================================================== */

#define KDSM_DEFAULT_COARSE    0.08
#define KDSM_DEFAULT_LEVELS    1
#define KDSM_DEFAULT_THICKNESS 0.08
#define KDSM_DEFAULT_NEAR      0.02
#define KDSM_DEFAULT_SMOOTH    0.05
#define KDSM_DEFAULT_KEPT      8
#define KDSM_DEFAULT_EPSILON   0.05

/* kdsm_desc_default() sets every field; the body is yours to set. All arrays are copied. Places,
 * displacements and joints of all calls below are numbers of -1e30 to 1e30: others are refused,
 * _ARGUMENT. */
typedef struct kdsm_desc {
    uint32_t      cookie;
    cloth_hooks   hooks;        /* allocator, log, parallel (the grid's); copied               */
    int           nv, nf;       /* of the body                                                 */
    const double *x;            /* [nv x 3] m at rest                                          */
    const int    *faces;        /* [nf x 3] closed, counter-clockwise seen from outside        */
    int           njoints;
    int           influences;   /* joints a vertex of the body                                 */
    const int    *joint;        /* [nv x influences] 0 .. njoints - 1                          */
    const double *weight;       /* [nv x influences] >= 0, scaled to sum 1; 0: unused place    */
    double        coarse;       /* m, cube of the lattice, > 0                                 */
    int           levels;       /* of red refinement near the body, 0 .. 6                     */
    double        thickness;    /* m, > 0: how far from the body the space reaches             */
    double        near;         /* m, (0, thickness]: as near to the surface it is refined     */
    double        cell;         /* m, of the distance grid; 0: half of the smallest cube       */
    double        smooth;       /* m, >= 0: as far as weights are diffused                     */
    int           kept;         /* joints a vertex of the space, 1 .. 64                       */
    double        epsilon;      /* [0, 1]: how far outside of a tetrahedron counts as in it    */
} kdsm_desc;

typedef struct kdsm_report {    /* of kdsm_create                                              */
    int    lattice;             /* tetrahedra of the lattice                                   */
    int    red, green;          /* kept: of the lattice or regular, of the closure             */
    int    forced;              /* refined by their neighbours' hanging vertices alone         */
    int    dropped;             /* leaves that do not meet the thickened body                  */
    double cut;                 /* largest weight left out by `kept`, before scaling           */
    double ms_grid, ms_mesh, ms_weights;        /* 0 without a clock                           */
} kdsm_report;

/* Arrays to read. Vertices that a face shares are the same: the mesh hangs together. */
typedef struct kdsm_space {
    int     nv, nt, njoints, kept;
    double *v;                  /* [nv x 3] m, at rest                                         */
    int    *tet;                /* [nt x 4] (v1-v0) . (v2-v0) x (v3-v0) > 0 at rest            */
    unsigned char *green;       /* [nt] 1: of the closure                                      */
    double *phi;                /* [nv] m, distance to the body at rest, negative inside       */
    int    *joint;              /* [nv x kept]                                                 */
    double *weight;             /* [nv x kept] falling, sum 1; places not used are 0, joint 0  */
    kdsm_report report;
} kdsm_space;

KDSM_API kdsm_desc kdsm_desc_default(void);

/* out  *out   owned: kdsm_destroy; NULL on failure
 * returns CLOTH_OK; _UNINIT; _ARGUMENT, _NONFINITE: field and value are logged; _MESH: the body is
 *   open or turned; _CAPACITY: a grid or a lattice too fine; _MEMORY
 * contract: alloc the space, the grid and scratch | cost: the grid's, then O(nt log nt), and nt for
 *   each joint and sweep of diffusion | deterministic */
KDSM_API cloth_status kdsm_create(const kdsm_desc *desc, kdsm_space **out);
KDSM_API void         kdsm_destroy(kdsm_space *space);                      /* NULL allowed    */

/* x [nv x 3] = the vertices of the list [n] (NULL: all) as the joints T [njoints x 12] carry them:
 * rows of [R | t], from rest to pose. Others are left as they are.
 * returns CLOTH_OK; _ARGUMENT, _NONFINITE: logged.  alloc none | cost O(n kept) */
KDSM_API cloth_status kdsm_skin(const kdsm_space *space, const double *T, int n, const int *list,
                                double *x);

typedef struct kdsm_quality {
    int    inverted;            /* tetrahedra without positive volume                          */
    double volume;              /* m^3, signed sum                                             */
    double smallest, largest;   /* m^3, of one                                                 */
    double angle_min, angle_max;        /* degrees, dihedral; of those not inverted            */
    double aspect, aspect_mean; /* longest edge / smallest height, over that of a regular one  */
} kdsm_quality;

/* x [nv x 3] m; NULL: at rest */
KDSM_API kdsm_quality kdsm_measure(const kdsm_space *space, const double *x);

/* ===== [2.2] A POSE OF IT ==================================================================== */

typedef struct kdsm_pose {      /* read; one thread at a time                                  */
    const kdsm_space *space;    /* borrowed                                                    */
    double *x;                  /* [space nv x 3] m, skinned                                   */
    double *body;               /* [body nv x 3] m, the body skinned                           */
} kdsm_pose;

/* At rest until set. Before the space it is to be destroyed. */
KDSM_API cloth_status kdsm_pose_create(const kdsm_space *space, kdsm_pose **out);
KDSM_API void         kdsm_pose_destroy(kdsm_pose *pose);                   /* NULL allowed    */
/* T as of kdsm_skin. On failure the pose is as before.   alloc none | cost O(nt) */
KDSM_API cloth_status kdsm_pose_set(kdsm_pose *pose, const double *T);

typedef struct kdsm_candidate {
    int    tet;
    double w[4];                /* barycentric, sum 1                                          */
    double depth;               /* the smallest of them; < 0: outside                          */
} kdsm_candidate;

/* Barycentric coordinates of p among corners a [4 x 3]; 0, and w untouched, where the volume is
 * below 1e-9 of the cube of the longest edge: such a tetrahedron holds no point. */
KDSM_API int kdsm_barycentric(const double *a, const double *p, double *w);

/* The tetrahedra of the pose that hold p: depth >= -epsilon, deepest first, of equals the first.
 * From the front: those behind that share a vertex with the face that p is nearest to (across from
 * the vertex of the smallest weight) are dropped, for they hold the same piece of space.    [5.2]
 * out  out     the first `max` of them; may be NULL where max is 0
 * out  count   all that are left
 * out  held    before any was dropped; may be NULL
 * returns CLOTH_OK; _ARGUMENT, _NONFINITE: logged; _MEMORY: when more are found than ever before */
KDSM_API cloth_status kdsm_locate(kdsm_pose *pose, const double p[3], int max,
                                  kdsm_candidate *out, int *count, int *held);

/* Points x [n x 3] over the body of one pose to out [n x 3] over that of another of the space: the
 * same place of the nearest face, as far along the normal there (method 2). What is nearest can
 * jump, so that the way back need not give x. out may be x.
 * returns CLOTH_OK; _ARGUMENT, _NONFINITE: logged.  alloc none | cost O(log nf) a point */
KDSM_API cloth_status kdsm_carry(const kdsm_pose *from, const kdsm_pose *to, int n, const double *x,
                                 double *out);

/* ===== [2.3] CLOTH IN IT ===================================================================== */

/* Where points u [n x 3] are at rest: tet [n] and barycentric w [n x 4], the deepest of those that
 * hold it; the nearest where none does, w then extends it.
 * out  outside   points that none holds; may be NULL
 * out  farthest  m, distance of the farthest of these; may be NULL
 * returns CLOTH_OK; _ARGUMENT, _NONFINITE: logged.  alloc none | cost O(log nt) a point */
KDSM_API cloth_status kdsm_embed(const kdsm_space *space, int n, const double *u, int *tet,
                                 double *w, int *outside, double *farthest);

/* The vertices that tet [n] names, rising, each once: list [space nv], *count. Scratch nv bytes. */
KDSM_API cloth_status kdsm_needed(const kdsm_space *space, int n, const int *tet, int *list,
                                  int *count);

/* x [n x 3] = sum_k w_k xv_k, xv [space nv x 3] a pose. F [n x 9], rows, NULL allowed: dx/du, the
 * derivative by the place at rest: the deformation gradient of the tetrahedron; its transposed
 * takes dL/dx to dL/du. returns CLOTH_OK; _ARGUMENT: logged.   alloc none */
KDSM_API cloth_status kdsm_evaluate(const kdsm_space *space, const double *xv, int n,
                                    const int *tet, const double *w, double *x, double *F);

/* A garment at rest in the space. */
typedef struct kdsm_cloth {     /* read                                                        */
    const kdsm_space *space;    /* borrowed                                                    */
    int     nv, nf;
    double *u;                  /* [nv x 3] m, at rest                                         */
    int    *faces;              /* [nf x 3]                                                    */
    int    *tet;                /* [nv]     embedding of u                                     */
    double *w;                  /* [nv x 4]                                                    */
    int     outside;            /* vertices that leave the space at rest                       */
    double  farthest;           /* m, by how much at most                                      */
} kdsm_cloth;

KDSM_API cloth_status kdsm_cloth_create(const kdsm_space *space, int nv, const double *u, int nf,
                                        const int *faces, kdsm_cloth **out);
KDSM_API void         kdsm_cloth_destroy(kdsm_cloth *cloth);                /* NULL allowed    */

typedef struct kdsm_place_report {
    int    skinned;             /* vertices of the space that were needed                      */
    int    outside;             /* vertices of cloth whose um leaves the space                 */
    double farthest;            /* m                                                           */
} kdsm_place_report;

/* x [nv x 3] of d [nv x 3] (NULL: 0) under the joints T: d -> re-embedding -> skinning of the
 * vertices needed. x may be d. report may be NULL.
 * returns CLOTH_OK; _ARGUMENT, _NONFINITE: logged; _MEMORY.   alloc scratch */
KDSM_API cloth_status kdsm_place(const kdsm_cloth *cloth, const double *T, const double *d,
                                 double *x, kdsm_place_report *report);

typedef enum kdsm_method {
    KDSM_RANDOM  = 1,           /* method 1: a candidate at random. No error, large d          */
    KDSM_SURFACE = 2,           /* method 2: offsets from the body's surface. Smooth, not exact */
    KDSM_HYBRID  = 3,           /* (default) the candidate next to method 2, else morphed      */
    KDSM_METHOD_FORCE_INT = 0x7fffffff
} kdsm_method;

typedef enum kdsm_origin {      /* where the d of a vertex is from                             */
    KDSM_FROM_ONE     = 1,      /* its only candidate                                          */
    KDSM_FROM_CHOICE  = 2,      /* one of several                                              */
    KDSM_FROM_MORPH   = 3,      /* hybrid: accepted beside a morphed place                     */
    KDSM_FROM_REST    = 4,      /* hybrid: the morphed place itself; not exact                 */
    KDSM_FROM_SURFACE = 5,      /* method 2, or method 1 where there is no candidate           */
    KDSM_ORIGIN_FORCE_INT = 0x7fffffff
} kdsm_origin;

typedef struct kdsm_options {
    uint32_t    cookie;         /* kdsm_options_default()                                      */
    kdsm_method method;
    uint64_t    seed;           /* method 1                                                    */
    double      accept;         /* m, hybrid, > 0; default 0.01                                */
} kdsm_options;

typedef struct kdsm_displace_report {
    int    none, one, several;  /* vertices by their number of candidates                      */
    int    epsilon;             /* that only the margin of a tetrahedron holds                 */
    int    origin[6];           /* vertices by kdsm_origin                                     */
    int    rounds;              /* hybrid: of morphing                                         */
    int    outside;             /* vertices whose um leaves the space                          */
    double error_max, error_mean;           /* m, |x - what d gives back|                      */
    double held_max;            /* m, the same over vertices held by what they took            */
    double d_max, d_mean;       /* m, |d|                                                      */
} kdsm_displace_report;

KDSM_API kdsm_options kdsm_options_default(void);

/* d [nv x 3] with which kdsm_place gives x [nv x 3] back, as well as the method can.       [6.2]
 * in   options  NULL: hybrid
 * out  origin   [nv] kdsm_origin, or NULL;  report, or NULL
 * returns CLOTH_OK; _UNINIT; _ARGUMENT, _NONFINITE: logged; _MEMORY; _NUMERIC: the morph's matrix
 * contract: alloc scratch | the vertex' draw depends on seed and its index alone */
KDSM_API cloth_status kdsm_displace(kdsm_cloth *cloth, kdsm_pose *pose, const double *x,
                                    const kdsm_options *options, double *d, int *origin,
                                    kdsm_displace_report *report);

#ifdef __cplusplus
}
#endif
#endif /* KDSM_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(KDSM_IMPLEMENTATION) && !defined(KDSM_IMPLEMENTED)
#define KDSM_IMPLEMENTED

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] MEMORY, SENTENCES, SMALL MATHS ================================================== */

#define KDSMI_HEAD 16                       /* bytes before a block: its size, alignment kept  */

/* count * size bytes of zeros, or NULL. */
static void *kdsmi_alloc(const cloth_hooks *hooks, size_t count, size_t size) {
    size_t bytes;
    void  *block;
    if (size && count > ((size_t)-1 - KDSMI_HEAD) / size) return NULL;
    bytes = count * size + KDSMI_HEAD;
    block = hooks->allocator.alloc ? hooks->allocator.alloc(bytes, hooks->allocator.user)
                                   : malloc(bytes);
    if (!block) return NULL;
    memset(block, 0, bytes);
    memcpy(block, &bytes, sizeof bytes);
    return (unsigned char *)block + KDSMI_HEAD;
}

static void kdsmi_free(const cloth_hooks *hooks, void *ptr) {
    size_t bytes;
    void  *block;
    if (!ptr) return;
    block = (unsigned char *)ptr - KDSMI_HEAD;
    memcpy(&bytes, block, sizeof bytes);
    if (hooks->allocator.free) hooks->allocator.free(block, bytes, hooks->allocator.user);
    else free(block);
}

static void *kdsmi_copy(const cloth_hooks *hooks, const void *from, size_t count, size_t size) {
    void *to = kdsmi_alloc(hooks, count, size);
    if (to) memcpy(to, from, count * size);
    return to;
}

typedef struct kdsmi_list {                 /* an array that grows                             */
    void  *at;
    size_t n, room;
} kdsmi_list;

/* Room for one more item; its address, NULL without memory: the list is as before then. */
static void *kdsmi_push(const cloth_hooks *hooks, kdsmi_list *l, size_t size) {
    if (l->n == l->room) {
        const size_t room = l->room < 32 ? 64 : l->room + l->room / 2;
        void        *grown = kdsmi_alloc(hooks, room, size);
        if (!grown) return NULL;
        if (l->n) memcpy(grown, l->at, l->n * size);
        kdsmi_free(hooks, l->at);
        l->at = grown, l->room = room;
    }
    return (unsigned char *)l->at + size * l->n++;
}

/* Logs a sentence and returns its status. */
static cloth_status kdsmi_fail(const cloth_hooks *hooks, cloth_status status, const char *format,
                               ...) {
    char    text[256];
    va_list args;
    if (!hooks->log.fn) return status;
    va_start(args, format);
    (void)vsnprintf(text, sizeof text, format, args);
    va_end(args);
    hooks->log.fn(CLOTH_LOG_ERROR, status, text, hooks->log.user);
    return status;
}

static cloth_status kdsmi_no_memory(const cloth_hooks *hooks, const char *what) {
    return kdsmi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %s", what);
}

static int kdsmi_finite(double a) { return a - a == 0; }

#define KDSMI_FAR 1e30                      /* the largest number of a place or of a joint     */

/* a [n], named `name`: there, finite and so small that fourth powers of places in a pose, KDSMI_FAR
 * times those at rest, are finite. */
static cloth_status kdsmi_check(const cloth_hooks *hooks, const char *name, const double *a,
                                size_t n) {
    size_t i;
    if (!a) return kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s is NULL", name);
    for (i = 0; i < n; i++)
        if (!kdsmi_finite(a[i]))
            return kdsmi_fail(hooks, CLOTH_ERR_NONFINITE, "%s[%lu] = %g", name, (unsigned long)i,
                              a[i]);
        else if (fabs(a[i]) > KDSMI_FAR)
            return kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s[%lu] = %g, at most 1e30", name,
                              (unsigned long)i, a[i]);
    return CLOTH_OK;
}

static double kdsmi_now(const cloth_hooks *hooks) {
    return hooks->clock.fn ? 1e3 * hooks->clock.fn(hooks->clock.user) : 0;
}

static double kdsmi_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void kdsmi_sub(const double *a, const double *b, double *out) {
    out[0] = a[0] - b[0], out[1] = a[1] - b[1], out[2] = a[2] - b[2];
}

static void kdsmi_cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double kdsmi_distance2(const double *a, const double *b) {
    double d[3];
    kdsmi_sub(a, b, d);
    return kdsmi_dot(d, d);
}

/* The corners of a tetrahedron, a [4 x 3]. */
static void kdsmi_corners(const double *x, const int *t, double *a) {
    int k;
    for (k = 0; k < 4; k++) memcpy(a + 3 * k, x + 3 * (size_t)t[k], 3 * sizeof(double));
}

/* Six volumes of a [4 x 3]; n [3 x 3]: e2 x e3, e3 x e1, e1 x e2, e_k = a_k - a_0. */
static double kdsmi_det(const double *a, double (*n)[3]) {
    double e[3][3];
    int    k;
    for (k = 0; k < 3; k++) kdsmi_sub(a + 3 * (k + 1), a, e[k]);
    for (k = 0; k < 3; k++) kdsmi_cross(e[(k + 1) % 3], e[(k + 2) % 3], n[k]);
    return kdsmi_dot(e[0], n[0]);
}

static const int kdsmi_edge[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

static double kdsmi_longest2(const double *a) {
    double most = 0;
    int    e;
    for (e = 0; e < 6; e++)
        most = fmax(most, kdsmi_distance2(a + 3 * kdsmi_edge[e][0], a + 3 * kdsmi_edge[e][1]));
    return most;
}

#define KDSMI_FLAT 1e-9                     /* of the cube of the longest edge: no volume      */

/* Cramer's rule, and once more for what rounding left of p: a flat tetrahedron loses no digits. */
KDSM_API int kdsm_barycentric(const double *a, const double *p, double *w) {
    double       n[3][3], r[3], l2 = kdsmi_longest2(a);
    const double det = kdsmi_det(a, n);
    int          k, pass;
    if (!(fabs(det) > KDSMI_FLAT * l2 * sqrt(l2))) return 0;
    w[0] = 1, w[1] = w[2] = w[3] = 0;
    for (pass = 0; pass < 2; pass++) {
        for (k = 0; k < 3; k++)
            r[k] = p[k] - a[k] - w[1] * (a[3 + k] - a[k]) - w[2] * (a[6 + k] - a[k])
                   - w[3] * (a[9 + k] - a[k]);
        for (k = 0; k < 3; k++) w[k + 1] += kdsmi_dot(n[k], r) / det;
    }
    w[0] = 1 - w[1] - w[2] - w[3];
    return 1;
}

/* Squared distance from p to the triangle a b c, w [3] the barycentric coordinates of the nearest
 * point: by the seven regions of the plane [Ericson, Real-Time Collision Detection, 5.1.5]. */
static double kdsmi_triangle2(const double *p, const double *a, const double *b, const double *c,
                              double *w) {
    double ab[3], ac[3], ap[3], bp[3], cp[3], q[3];
    double d1, d2, d3, d4, d5, d6, va, vb, vc, sum;
    int    k;
    kdsmi_sub(b, a, ab), kdsmi_sub(c, a, ac);
    kdsmi_sub(p, a, ap), kdsmi_sub(p, b, bp), kdsmi_sub(p, c, cp);
    d1 = kdsmi_dot(ab, ap), d2 = kdsmi_dot(ac, ap), d3 = kdsmi_dot(ab, bp);
    d4 = kdsmi_dot(ac, bp), d5 = kdsmi_dot(ab, cp), d6 = kdsmi_dot(ac, cp);
    va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    w[1] = w[2] = 0;
    if (d1 <= 0 && d2 <= 0) w[1] = 0;
    else if (d3 >= 0 && d4 <= d3) w[1] = 1;
    else if (d6 >= 0 && d5 <= d6) w[2] = 1;
    else if (vc <= 0 && d1 >= 0 && d3 <= 0) w[1] = d1 > d3 ? d1 / (d1 - d3) : 0;
    else if (vb <= 0 && d2 >= 0 && d6 <= 0) w[2] = d2 > d6 ? d2 / (d2 - d6) : 0;
    else if (va <= 0 && d4 >= d3 && d5 >= d6) {
        sum = (d4 - d3) + (d5 - d6);
        w[2] = sum > 0 ? (d4 - d3) / sum : 0;
        w[1] = 1 - w[2];
    } else {
        sum = va + vb + vc;
        w[1] = sum > 0 ? vb / sum : 0, w[2] = sum > 0 ? vc / sum : 0;
    }
    w[0] = 1 - w[1] - w[2];
    for (k = 0; k < 3; k++) q[k] = w[0] * a[k] + w[1] * b[k] + w[2] * c[k];
    return kdsmi_distance2(p, q);
}

/* ===== [3.2] HIERARCHY OF BOXES ==============================================================
 *
 * Items are halved by the median of their boxes' middles along the widest axis until one is left.
 * Nodes lie in preorder: the left child of node i is i + 1, the right one follows all of its
 * nodes, so that no pointer is kept and a pass from the back refits all boxes. Ties go by index:
 * the tree is a function of its boxes.
 * checked: tests/test_kdsm.c: locate_is_brute_force */

typedef struct kdsmi_tree {
    int     n;                              /* items, at least 1                               */
    int    *item;                           /* [n]                                             */
    int   (*range)[2];                      /* [2n - 1] of item                                */
    double (*node)[6];                      /* [2n - 1] lo, hi                                 */
    double (*box)[6];                       /* [n] by item, to be set by the owner             */
} kdsmi_tree;

static void kdsmi_tree_free(const cloth_hooks *hooks, kdsmi_tree *t) {
    kdsmi_free(hooks, t->item), kdsmi_free(hooks, t->range);
    kdsmi_free(hooks, t->node), kdsmi_free(hooks, t->box);
    memset(t, 0, sizeof *t);
}

/* Arrays alone. 0 without memory. */
static int kdsmi_tree_make(const cloth_hooks *hooks, int n, kdsmi_tree *t) {
    t->n = n;
    t->item = (int *)kdsmi_alloc(hooks, (size_t)n, sizeof(int));
    t->range = (int(*)[2])kdsmi_alloc(hooks, 2 * (size_t)n, 2 * sizeof(int));
    t->node = (double(*)[6])kdsmi_alloc(hooks, 2 * (size_t)n, 6 * sizeof(double));
    t->box = (double(*)[6])kdsmi_alloc(hooks, (size_t)n, 6 * sizeof(double));
    return t->item && t->range && t->node && t->box;
}

static int kdsmi_before(const kdsmi_tree *t, int axis, int a, int b) {
    const double p = t->box[a][axis] + t->box[a][axis + 3];
    const double q = t->box[b][axis] + t->box[b][axis + 3];
    return p < q || (!(q < p) && a < b);
}

/* Quickselect: item[mid] as if item[b .. e) were sorted. */
static void kdsmi_median(kdsmi_tree *t, int axis, int b, int e, int mid) {
    for (e--; b < e;) {
        const int pivot = t->item[b + (e - b) / 2];
        int       i = b, j = e;
        while (i <= j) {
            while (kdsmi_before(t, axis, t->item[i], pivot)) i++;
            while (kdsmi_before(t, axis, pivot, t->item[j])) j--;
            if (i > j) break;
            {
                const int swap = t->item[i];
                t->item[i++] = t->item[j];
                t->item[j--] = swap;
            }
        }
        if (mid <= j) e = j;
        else if (mid >= i) b = i;
        else return;
    }
}

static int kdsmi_widest(const kdsmi_tree *t, int b, int e) {
    double lo[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, hi[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    int    i, k, axis = 0;
    for (i = b; i < e; i++)
        for (k = 0; k < 3; k++) {
            const double m = t->box[t->item[i]][k] + t->box[t->item[i]][k + 3];
            lo[k] = fmin(lo[k], m), hi[k] = fmax(hi[k], m);
        }
    for (k = 1; k < 3; k++) axis = hi[k] - lo[k] > hi[axis] - lo[axis] ? k : axis;
    return axis;
}

static int kdsmi_right(const kdsmi_tree *t, int i) {
    return i + 2 * ((t->range[i][1] - t->range[i][0]) / 2);
}

static void kdsmi_tree_refit(kdsmi_tree *t) {
    int i, k;
    for (i = 2 * t->n - 2; i >= 0; i--) {
        const double *l, *r;
        if (t->range[i][1] - t->range[i][0] == 1) {
            memcpy(t->node[i], t->box[t->item[t->range[i][0]]], sizeof t->node[i]);
            continue;
        }
        l = t->node[i + 1], r = t->node[kdsmi_right(t, i)];
        for (k = 0; k < 3; k++)
            t->node[i][k] = fmin(l[k], r[k]), t->node[i][k + 3] = fmax(l[k + 3], r[k + 3]);
    }
}

/* Sorts the items by t->box. A node's range is known before its children are reached. */
static void kdsmi_tree_build(kdsmi_tree *t) {
    int i;
    for (i = 0; i < t->n; i++) t->item[i] = i;
    t->range[0][0] = 0, t->range[0][1] = t->n;
    for (i = 0; i < 2 * t->n - 1; i++) {
        const int b = t->range[i][0], e = t->range[i][1], mid = b + (e - b) / 2;
        if (e - b == 1) continue;
        kdsmi_median(t, kdsmi_widest(t, b, e), b, e, mid);
        t->range[i + 1][0] = b, t->range[i + 1][1] = mid;
        t->range[kdsmi_right(t, i)][0] = mid, t->range[kdsmi_right(t, i)][1] = e;
    }
    kdsmi_tree_refit(t);
}

typedef struct kdsmi_walk {                 /* items whose box holds a point                   */
    const kdsmi_tree *t;
    int               stack[64], n;
} kdsmi_walk;

static void kdsmi_walk_start(kdsmi_walk *w, const kdsmi_tree *t) {
    w->t = t, w->n = 1, w->stack[0] = 0;
}

/* The next item, -1: no more. Depth is log2 n: the stack holds it. */
static int kdsmi_walk_next(kdsmi_walk *w, const double *p) {
    while (w->n > 0) {
        const int     i = w->stack[--w->n], b = w->t->range[i][0];
        const double *box = w->t->node[i];
        if (p[0] < box[0] || p[1] < box[1] || p[2] < box[2] || p[0] > box[3] || p[1] > box[4]
            || p[2] > box[5]) continue;
        if (w->t->range[i][1] - b == 1) return w->t->item[b];
        w->stack[w->n++] = kdsmi_right(w->t, i);
        w->stack[w->n++] = i + 1;
    }
    return -1;
}

static double kdsmi_box2(const double *box, const double *p) {
    double sum = 0;
    int    k;
    for (k = 0; k < 3; k++) {
        const double d = fmax(fmax(box[k] - p[k], p[k] - box[k + 3]), 0);
        sum += d * d;
    }
    return sum;
}

/* The item of the smallest far(item, p, ctx), of equal ones the first, and *best its value; far is
 * no less than the squared distance of the item's box. */
static int kdsmi_tree_nearest(const kdsmi_tree *t, const double *p,
                              double (*far)(int item, const double *p, const void *ctx),
                              const void *ctx, double *best) {
    int    stack[64], n = 1, found = -1;
    stack[0] = 0;
    *best = HUGE_VAL;
    while (n > 0) {
        const int i = stack[--n], b = t->range[i][0];
        if (kdsmi_box2(t->node[i], p) > *best) continue;
        if (t->range[i][1] - b == 1) {
            const double d = far(t->item[b], p, ctx);
            if (d < *best || (!(d > *best) && t->item[b] < found)) *best = d, found = t->item[b];
        } else {
            const int right = kdsmi_right(t, i);
            const int near_left = kdsmi_box2(t->node[i + 1], p) <= kdsmi_box2(t->node[right], p);
            stack[n++] = near_left ? right : i + 1;
            stack[n++] = near_left ? i + 1 : right;
        }
    }
    return found;
}

/* The box of n points of x, named by index. */
static void kdsmi_box(const double *x, const int *of, int n, double *box) {
    int i, k;
    for (k = 0; k < 3; k++) box[k] = HUGE_VAL, box[k + 3] = -HUGE_VAL;
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            box[k] = fmin(box[k], x[3 * (size_t)of[i] + (size_t)k]);
            box[k + 3] = fmax(box[k + 3], x[3 * (size_t)of[i] + (size_t)k]);
        }
}

/* ===== [4.1] LATTICE =========================================================================
 *
 *     o-------o       Body-centred cubic: the corners of cubes of side h and their middles. Two
 *    /|  c   /|       middles c, c' of cubes side by side and an edge p q of the face between them
 *   o-------o | c'    make a tetrahedron: 12 a cube, all alike, dihedral angles 60 and 90 degrees.
 *   | o-----|-o       Its two edges of length h, c c' and p q, are opposite; the other four have
 *   |/      |/        sqrt(3)/2 h. Corners are kept in that order, so that (0 1) and (2 3) are the
 *   o-------o         long edges: [4.2] cuts along the shortest diagonal without looking for it.
 *
 * What meets the body is decided by the distance phi of the grid. It falls by no more than the way
 * gone: a tetrahedron of radius r about its middle m meets phi < c if phi(m) < c, and cannot if
 * phi(m) >= c + r; in between it is halved across its longest edge, until r is half a cell.
 *
 * checked: tests/test_kdsm.c: mesh_hangs_together, mesh_covers_the_thickened_body */

typedef struct kdsmi_part {                 /* a regular tetrahedron                           */
    int v[4];
    int level;                              /* 0: of the lattice; -1 - level: cut into eight   */
} kdsmi_part;

typedef struct kdsmi_maker {
    const kdsm_desc  *d;
    const cloth_grid *grid;
    kdsm_report      *rep;
    kdsmi_list        x, part;              /* double [3], kdsmi_part                          */
    kdsmi_list        tet, green;           /* int [4], unsigned char: what is kept            */
    int              *corner, *middle;      /* of the lattice, -1: not yet a vertex            */
    int               n[3];                 /* cubes                                           */
    double            lo[3];
    uint64_t         *key;                  /* edges that are halved: a hash table             */
    int              *mid;                  /* their middles, -1: free slot                    */
    size_t            slots, used;
} kdsmi_maker;

/* phi, or with `both` its absolute value, at x. */
static double kdsmi_phi(const cloth_grid *grid, const double *x, int both) {
    double phi = 0;
    (void)cloth_grid_sample(grid, x, &phi, NULL);
    return both ? fabs(phi) : phi;
}

/* 1 where phi (|phi|) < c somewhere in corners a [4 x 3], to half a cell. */
static int kdsmi_meets(const cloth_grid *grid, const double *a, double c, int both) {
    double stack[48][12];
    int    n = 1, k, e;
    memcpy(stack[0], a, sizeof stack[0]);
    while (n > 0) {
        double *t = stack[--n], *u = stack[n + 1], m[3], r2 = 0, most = 0, phi;
        int     cut = 0;
        for (k = 0; k < 3; k++) m[k] = 0.25 * (t[k] + t[k + 3] + t[k + 6] + t[k + 9]);
        for (k = 0; k < 4; k++) r2 = fmax(r2, kdsmi_distance2(m, t + 3 * k));
        phi = kdsmi_phi(grid, m, both);
        if (phi < c) return 1;
        if (phi >= c + sqrt(r2)) continue;
        if (r2 < 0.25 * grid->cell * grid->cell || n > 45) return 1;
        for (e = 0; e < 6; e++) {
            const double l2 = kdsmi_distance2(t + 3 * kdsmi_edge[e][0], t + 3 * kdsmi_edge[e][1]);
            if (l2 > most) most = l2, cut = e;
        }
        memcpy(u, t, sizeof stack[0]);
        for (k = 0; k < 3; k++)
            t[3 * kdsmi_edge[cut][0] + k] = u[3 * kdsmi_edge[cut][1] + k] =
                0.5 * (t[3 * kdsmi_edge[cut][0] + k] + t[3 * kdsmi_edge[cut][1] + k]);
        n += 2;
    }
    return 0;
}

/* A new vertex, -1: no memory. */
static int kdsmi_vertex(kdsmi_maker *m, const double *x) {
    double *at = (double *)kdsmi_push(&m->d->hooks, &m->x, 3 * sizeof(double));
    if (!at || m->x.n > 0x0fffffff) return -1;
    memcpy(at, x, 3 * sizeof(double));
    return (int)m->x.n - 1;
}

static const double *kdsmi_at(const kdsmi_maker *m, int v) {
    return (const double *)m->x.at + 3 * (size_t)v;
}

/* A part of these corners, the last two exchanged where it were inverted. 0: no memory. */
static int kdsmi_part_add(kdsmi_maker *m, int a, int b, int c, int d, int level) {
    kdsmi_part *p = (kdsmi_part *)kdsmi_push(&m->d->hooks, &m->part, sizeof *p);
    double      corner[12], n[3][3];
    int         v[4];
    if (!p || m->part.n > 0x0fffffff) return 0;
    v[0] = a, v[1] = b, v[2] = c, v[3] = d;
    kdsmi_corners((const double *)m->x.at, v, corner);
    if (kdsmi_det(corner, n) < 0) v[2] = d, v[3] = c;
    memcpy(p->v, v, sizeof v);
    p->level = level;
    return 1;
}

/* Lays cubes round the body, one more than the thickened body needs, and the tables of vertices. */
static cloth_status kdsmi_lattice_room(kdsmi_maker *m) {
    const kdsm_desc *d = m->d;
    double           lo[3], hi[3], cubes = 1, n;
    size_t           all = 1, nodes = 1;
    int              i, k;
    for (k = 0; k < 3; k++) lo[k] = HUGE_VAL, hi[k] = -HUGE_VAL;
    for (i = 0; i < 3 * d->nf; i++)
        for (k = 0; k < 3; k++) {
            lo[k] = fmin(lo[k], d->x[3 * (size_t)d->faces[i] + (size_t)k]);
            hi[k] = fmax(hi[k], d->x[3 * (size_t)d->faces[i] + (size_t)k]);
        }
    for (k = 0; k < 3; k++) {
        n = ceil((hi[k] - lo[k] + 2 * d->thickness) / d->coarse) + 2;
        cubes *= n;
        if (!(cubes < 5e7))
            return kdsmi_fail(&d->hooks, CLOTH_ERR_CAPACITY, "desc.coarse = %g makes more than "
                              "5e7 cubes", d->coarse);
        m->n[k] = (int)n;
        m->lo[k] = 0.5 * (lo[k] + hi[k]) - 0.5 * d->coarse * n;
        all *= (size_t)m->n[k], nodes *= (size_t)m->n[k] + 1;
    }
    m->corner = (int *)kdsmi_alloc(&d->hooks, nodes, sizeof(int));
    m->middle = (int *)kdsmi_alloc(&d->hooks, all, sizeof(int));
    if (!m->corner || !m->middle) return kdsmi_no_memory(&d->hooks, "the lattice");
    memset(m->corner, 0xff, nodes * sizeof(int));
    memset(m->middle, 0xff, all * sizeof(int));
    return CLOTH_OK;
}

/* The point of the lattice at node c (middle: of cube c): its place x, and its vertex' slot. */
static int *kdsmi_lattice_point(kdsmi_maker *m, const int *c, int middle, double *x) {
    const size_t nx = (size_t)m->n[0] + !middle, ny = (size_t)m->n[1] + !middle;
    int          k;
    for (k = 0; k < 3; k++) x[k] = m->lo[k] + m->d->coarse * (c[k] + 0.5 * middle);
    return (middle ? m->middle : m->corner)
           + (((size_t)c[2] * ny + (size_t)c[1]) * nx + (size_t)c[0]);
}

/* The four tetrahedra between cube c and the next along an axis, those that meet the body. */
static int kdsmi_lattice_face(kdsmi_maker *m, const int *c, int axis) {
    static const int ring[5][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
    double           a[12];
    int             *slot[4], node[3], side, k;
    memcpy(node, c, sizeof node);
    slot[0] = kdsmi_lattice_point(m, node, 1, a);
    node[axis]++;
    slot[1] = kdsmi_lattice_point(m, node, 1, a + 3);
    for (side = 0; side < 4; side++) {
        for (k = 0; k < 2; k++) {
            node[(axis + 1) % 3] = c[(axis + 1) % 3] + ring[side + k][0];
            node[(axis + 2) % 3] = c[(axis + 2) % 3] + ring[side + k][1];
            slot[2 + k] = kdsmi_lattice_point(m, node, 0, a + 6 + 3 * k);
        }
        if (!kdsmi_meets(m->grid, a, m->d->thickness, 0)) continue;
        for (k = 0; k < 4; k++)
            if (*slot[k] < 0 && (*slot[k] = kdsmi_vertex(m, a + 3 * k)) < 0) return 0;
        if (!kdsmi_part_add(m, *slot[0], *slot[1], *slot[2], *slot[3], 0)) return 0;
    }
    return 1;
}

static cloth_status kdsmi_lattice(kdsmi_maker *m) {
    cloth_status status = kdsmi_lattice_room(m);
    int          c[3], axis;
    if (status) return status;
    for (c[2] = 0; c[2] < m->n[2]; c[2]++)
        for (c[1] = 0; c[1] < m->n[1]; c[1]++)
            for (c[0] = 0; c[0] < m->n[0]; c[0]++)
                for (axis = 0; axis < 3; axis++)
                    if (c[axis] + 1 < m->n[axis] && !kdsmi_lattice_face(m, c, axis))
                        return kdsmi_no_memory(&m->d->hooks, "the lattice");
    m->rep->lattice = (int)m->part.n;
    return CLOTH_OK;
}

/* ===== [4.2] RED AND GREEN ===================================================================
 *
 * Red: a regular tetrahedron is cut into eight by the middles of its edges, four at the corners and
 * four round the shortest diagonal of the octahedron between, that from long edge to long edge: all
 * eight are again of the lattice, of half the size, so that refinement costs no quality.
 * Green: what then has middles on its edges without being cut itself is closed, once, at the end:
 *
 *     one edge halved           two pieces       Two edges of one face: the third is halved too.
 *     two edges, opposite       four             Anything else, or an edge of a piece halved
 *     the three of a face       four             again: red.
 *
 * A face is cut by which of its edges are halved and by nothing else, so that both its sides agree;
 * no green piece is ever cut again.                                          [MBTF03] section 3
 *
 * checked: tests/test_kdsm.c: mesh_hangs_together, mesh_covers_the_thickened_body */

static const int kdsmi_face_edges[4][3] = {{3, 4, 5}, {1, 2, 5}, {0, 2, 4}, {0, 1, 3}};

static size_t kdsmi_slot(const kdsmi_maker *m, uint64_t key) {
    uint64_t h = key * 0x9e3779b97f4a7c15u;
    size_t   i = (size_t)(h ^ h >> 29) & (m->slots - 1);
    while (m->mid[i] >= 0 && m->key[i] != key) i = (i + 1) & (m->slots - 1);
    return i;
}

static uint64_t kdsmi_key(int a, int b) {
    return a < b ? (uint64_t)a << 32 | (uint64_t)b : (uint64_t)b << 32 | (uint64_t)a;
}

/* The middle of edge a b, -1: it is whole. */
static int kdsmi_mid(const kdsmi_maker *m, int a, int b) {
    return m->slots ? m->mid[kdsmi_slot(m, kdsmi_key(a, b))] : -1;
}

static int kdsmi_rehash(kdsmi_maker *m) {
    const size_t old = m->slots, slots = old ? 2 * old : 1024;
    uint64_t    *key = m->key;
    int         *mid = m->mid;
    size_t       i;
    m->key = (uint64_t *)kdsmi_alloc(&m->d->hooks, slots, sizeof(uint64_t));
    m->mid = (int *)kdsmi_alloc(&m->d->hooks, slots, sizeof(int));
    if (!m->key || !m->mid) {
        kdsmi_free(&m->d->hooks, m->key), kdsmi_free(&m->d->hooks, m->mid);
        m->key = key, m->mid = mid;
        return 0;
    }
    m->slots = slots;
    memset(m->mid, 0xff, slots * sizeof(int));
    for (i = 0; i < old; i++) {
        size_t at;
        if (mid[i] < 0) continue;
        at = kdsmi_slot(m, key[i]);
        m->key[at] = key[i], m->mid[at] = mid[i];
    }
    kdsmi_free(&m->d->hooks, key), kdsmi_free(&m->d->hooks, mid);
    return 1;
}

/* The middle of edge a b, made where it is whole; -1: no memory. */
static int kdsmi_halve(kdsmi_maker *m, int a, int b) {
    double x[3];
    size_t at;
    int    k;
    if (2 * m->used >= m->slots && !kdsmi_rehash(m)) return -1;
    at = kdsmi_slot(m, kdsmi_key(a, b));
    if (m->mid[at] >= 0) return m->mid[at];
    for (k = 0; k < 3; k++) x[k] = 0.5 * (kdsmi_at(m, a)[k] + kdsmi_at(m, b)[k]);
    m->key[at] = kdsmi_key(a, b);
    m->mid[at] = kdsmi_vertex(m, x);
    m->used += m->mid[at] >= 0;
    return m->mid[at];
}

/* Cuts part i into eight. 0: no memory. */
static int kdsmi_red(kdsmi_maker *m, size_t i) {
    kdsmi_part p = ((kdsmi_part *)m->part.at)[i];
    const int  l = p.level + 1, *v = p.v;
    int        e[6], k;
    for (k = 0; k < 6; k++)
        if ((e[k] = kdsmi_halve(m, v[kdsmi_edge[k][0]], v[kdsmi_edge[k][1]])) < 0) return 0;
    ((kdsmi_part *)m->part.at)[i].level = -l;
    /* edges 01 02 03 12 13 23: corners, then the ring 02 12 13 03 about the diagonal 01 23 */
    return kdsmi_part_add(m, v[0], e[0], e[1], e[2], l)
           && kdsmi_part_add(m, e[0], v[1], e[3], e[4], l)
           && kdsmi_part_add(m, e[1], e[3], v[2], e[5], l)
           && kdsmi_part_add(m, e[2], e[4], e[5], v[3], l)
           && kdsmi_part_add(m, e[0], e[5], e[1], e[3], l)
           && kdsmi_part_add(m, e[0], e[5], e[3], e[4], l)
           && kdsmi_part_add(m, e[0], e[5], e[4], e[2], l)
           && kdsmi_part_add(m, e[0], e[5], e[2], e[1], l);
}

/* Red near the surface: level after level, what meets |phi| < near. */
static cloth_status kdsmi_refine(kdsmi_maker *m) {
    double a[12];
    int    level;
    for (level = 0; level < m->d->levels; level++) {
        const size_t n = m->part.n;
        size_t       i;
        for (i = 0; i < n; i++) {
            const kdsmi_part p = ((const kdsmi_part *)m->part.at)[i];
            if (p.level != level) continue;
            kdsmi_corners((const double *)m->x.at, p.v, a);
            if (kdsmi_meets(m->grid, a, m->d->near, 1) && !kdsmi_red(m, i))
                return kdsmi_no_memory(&m->d->hooks, "refinement");
        }
    }
    return CLOTH_OK;
}

/* The middles e [6] of a part's edges, -1 where whole; returns how many, 7 when the part must be
 * cut because a piece of an edge, or the edge between two middles in a face, is halved again. */
static int kdsmi_middles(const kdsmi_maker *m, const int *v, int *e) {
    int k, j, n = 0;
    for (k = 0; k < 6; k++) {
        const int a = v[kdsmi_edge[k][0]], b = v[kdsmi_edge[k][1]];
        if ((e[k] = kdsmi_mid(m, a, b)) < 0) continue;
        if (kdsmi_mid(m, a, e[k]) >= 0 || kdsmi_mid(m, e[k], b) >= 0) return 7;
        n++;
    }
    for (k = 0; k < 4; k++)
        for (j = 0; j < 3; j++) {
            const int p = e[kdsmi_face_edges[k][j]], q = e[kdsmi_face_edges[k][(j + 1) % 3]];
            if (p >= 0 && q >= 0 && kdsmi_mid(m, p, q) >= 0) return 7;
        }
    return n;
}

/* The face all of whose edges are halved, -1: there is none. */
static int kdsmi_whole_face(const int *e) {
    int k;
    for (k = 0; k < 4; k++)
        if (e[kdsmi_face_edges[k][0]] >= 0 && e[kdsmi_face_edges[k][1]] >= 0
            && e[kdsmi_face_edges[k][2]] >= 0) return k;
    return -1;
}

/* The pattern of one part: 0 green can close it, 1 something was changed, -1 no memory. */
static int kdsmi_settle(kdsmi_maker *m, size_t i) {
    const kdsmi_part p = ((const kdsmi_part *)m->part.at)[i];
    int              e[6], n = kdsmi_middles(m, p.v, e), k, j, first = -1, second = -1;
    if (n <= 1 || (n == 3 && kdsmi_whole_face(e) >= 0)) return 0;
    if (n == 2) {
        for (k = 0; k < 6; k++)
            if (e[k] >= 0) second = first < 0 ? second : k, first = first < 0 ? k : first;
        if (first + second == 5) return 0;
        for (k = 0; k < 4; k++) {           /* the face of both: its third edge */
            const int *f = kdsmi_face_edges[k];
            for (n = 0, j = 0; j < 3; j++) n += f[j] == first || f[j] == second;
            for (j = 0; j < 3 && n == 2; j++)
                if (kdsmi_halve(m, p.v[kdsmi_edge[f[j]][0]], p.v[kdsmi_edge[f[j]][1]]) < 0)
                    return -1;
        }
        return 1;
    }
    m->rep->forced++;
    return kdsmi_red(m, i) ? 1 : -1;
}

static cloth_status kdsmi_close(kdsmi_maker *m) {
    int changed = 1;
    while (changed) {
        size_t i;
        for (changed = 0, i = 0; i < m->part.n; i++) {
            int answer = 0;
            if (((const kdsmi_part *)m->part.at)[i].level >= 0) answer = kdsmi_settle(m, i);
            if (answer < 0) return kdsmi_no_memory(&m->d->hooks, "refinement");
            changed |= answer;
        }
    }
    return CLOTH_OK;
}

/* Keeps the piece a b c d of a leaf where it meets the thickened body. 0: no memory. */
static int kdsmi_keep(kdsmi_maker *m, int green, int a, int b, int c, int d) {
    double         corner[12], n[3][3];
    int            v[4], *to;
    unsigned char *mark;
    v[0] = a, v[1] = b, v[2] = c, v[3] = d;
    kdsmi_corners((const double *)m->x.at, v, corner);
    if (!kdsmi_meets(m->grid, corner, m->d->thickness, 0)) {
        m->rep->dropped++;
        return 1;
    }
    if (kdsmi_det(corner, n) < 0) v[2] = d, v[3] = c;
    to = (int *)kdsmi_push(&m->d->hooks, &m->tet, sizeof v);
    mark = (unsigned char *)kdsmi_push(&m->d->hooks, &m->green, 1);
    if (!to || !mark) return 0;
    memcpy(to, v, sizeof v);
    *mark = (unsigned char)green;
    if (green) m->rep->green++;
    else m->rep->red++;
    return 1;
}

/* The pieces of a leaf by its halved edges. */
static int kdsmi_pieces(kdsmi_maker *m, const int *v) {
    int       e[6], n = kdsmi_middles(m, v, e), k = 0;
    const int face = kdsmi_whole_face(e);
    if (n == 0) return kdsmi_keep(m, 0, v[0], v[1], v[2], v[3]);
    if (face >= 0) {
        const int *f = kdsmi_face_edges[face], apex = v[face];
        const int  ab = e[f[0]], ac = e[f[1]], bc = e[f[2]];
        const int  a = v[kdsmi_edge[f[0]][0]], b = v[kdsmi_edge[f[0]][1]];
        const int  c = v[kdsmi_edge[f[1]][1]];
        return kdsmi_keep(m, 1, a, ab, ac, apex) && kdsmi_keep(m, 1, ab, b, bc, apex)
               && kdsmi_keep(m, 1, ac, bc, c, apex) && kdsmi_keep(m, 1, ab, bc, ac, apex);
    }
    while (e[k] < 0) k++;
    {
        const int a = v[kdsmi_edge[k][0]], b = v[kdsmi_edge[k][1]], half = e[k];
        const int c = v[kdsmi_edge[5 - k][0]], d = v[kdsmi_edge[5 - k][1]];
        if (n == 1) return kdsmi_keep(m, 1, a, half, c, d) && kdsmi_keep(m, 1, half, b, c, d);
        return kdsmi_keep(m, 1, a, half, c, e[5 - k]) && kdsmi_keep(m, 1, a, half, e[5 - k], d)
               && kdsmi_keep(m, 1, half, b, c, e[5 - k]) && kdsmi_keep(m, 1, half, b, e[5 - k], d);
    }
}

/* Tetrahedra from the leaves, and vertices numbered as these first name them. */
static cloth_status kdsmi_emit(kdsmi_maker *m, kdsm_space *s) {
    const cloth_hooks *hooks = &m->d->hooks;
    int               *number = NULL;
    size_t             i;
    for (i = 0; i < m->part.n; i++) {
        const kdsmi_part p = ((const kdsmi_part *)m->part.at)[i];
        if (p.level >= 0 && !kdsmi_pieces(m, p.v)) return kdsmi_no_memory(hooks, "tetrahedra");
    }
    if (!m->tet.n)
        return kdsmi_fail(hooks, CLOTH_ERR_MESH, "no tetrahedron meets the body: desc.coarse = %g",
                          m->d->coarse);
    number = (int *)kdsmi_alloc(hooks, m->x.n, sizeof(int));
    s->v = (double *)kdsmi_alloc(hooks, 3 * m->x.n, sizeof(double));
    if (!number || !s->v) {
        kdsmi_free(hooks, number);
        return kdsmi_no_memory(hooks, "vertices of the space");
    }
    s->nt = (int)m->tet.n;
    s->tet = (int *)m->tet.at, m->tet.at = NULL;
    s->green = (unsigned char *)m->green.at, m->green.at = NULL;
    for (i = 0; i < 4 * (size_t)s->nt; i++) {
        const int v = s->tet[i];
        if (!number[v]) {
            memcpy(s->v + 3 * (size_t)s->nv, kdsmi_at(m, v), 3 * sizeof(double));
            number[v] = ++s->nv;
        }
        s->tet[i] = number[v] - 1;
    }
    kdsmi_free(hooks, number);
    return CLOTH_OK;
}

static void kdsmi_maker_free(kdsmi_maker *m) {
    const cloth_hooks *hooks = &m->d->hooks;
    kdsmi_free(hooks, m->x.at), kdsmi_free(hooks, m->part.at), kdsmi_free(hooks, m->tet.at);
    kdsmi_free(hooks, m->green.at), kdsmi_free(hooks, m->corner), kdsmi_free(hooks, m->middle);
    kdsmi_free(hooks, m->key), kdsmi_free(hooks, m->mid);
}

/* ===== [4.3] WEIGHTS =========================================================================
 *
 * A vertex of the space begins with the weights of the nearest point of the body. These jump where
 * two points are equally near (between arm and trunk, between the legs); sweeps of diffusion make
 * the jump a slope, the steeper the nearer to the body, whose own weights stay:
 *
 *     w_i <- (1 - a_i) w_i + a_i mean of w over the other corners of i's tetrahedra    n sweeps
 *     a_i  = min(1/2, 3 smooth^2 / (n h_i^2)) min(1, phi_i^2 / near^2)
 *
 * h_i^2 the mean square of the edges at i: a sweep is a step of the random walk that goes `smooth`
 * along each axis in n of them, whatever the mesh; n such that 1/2 is not exceeded where it is
 * finest. Means keep every weight in [0, 1] and their sum at 1. One joint at a time: the memory is
 * that of the `kept` largest a vertex; what these leave out is scaled away (report.cut).
 *
 * checked: tests/test_kdsm.c: weights_are_a_partition */

typedef struct kdsmi_space {
    kdsm_space  pub;                        /* first: the public pointer is ours               */
    cloth_hooks hooks;
    int         nb, fb, influences;         /* the body's vertices, faces, joints a vertex     */
    double     *bx, *bw, *bn;               /* its places, weights and normals at rest         */
    int        *bf, *bj;
    double      epsilon, near;
    kdsmi_tree  tree;                       /* of the tetrahedra at rest                       */
} kdsmi_space;

typedef struct kdsmi_surface {
    const double *x;
    const int    *faces;
} kdsmi_surface;

static double kdsmi_surface_far(int f, const double *p, const void *ctx) {
    const kdsmi_surface *s = (const kdsmi_surface *)ctx;
    const int           *v = s->faces + 3 * (size_t)f;
    double               w[3];
    return kdsmi_triangle2(p, s->x + 3 * (size_t)v[0], s->x + 3 * (size_t)v[1],
                           s->x + 3 * (size_t)v[2], w);
}

/* The face nearest to p and the barycentric coordinates w [3] of the point there. */
static int kdsmi_surface_nearest(const kdsmi_tree *t, const kdsmi_surface *s, const double *p,
                                 double *w) {
    double       best;
    const int    f = kdsmi_tree_nearest(t, p, kdsmi_surface_far, s, &best);
    const int   *v = s->faces + 3 * (size_t)f;
    (void)kdsmi_triangle2(p, s->x + 3 * (size_t)v[0], s->x + 3 * (size_t)v[1],
                          s->x + 3 * (size_t)v[2], w);
    return f;
}

static void kdsmi_surface_boxes(kdsmi_tree *t, const double *x, const int *faces) {
    int f;
    for (f = 0; f < t->n; f++) kdsmi_box(x, faces + 3 * (size_t)f, 3, t->box[f]);
}

/* Unit normals of vertices, weighted by area; 0 where faces cancel. */
static void kdsmi_normals(int nv, const double *x, int nf, const int *faces, double *n) {
    int f, k, c;
    memset(n, 0, 3 * (size_t)nv * sizeof(double));
    for (f = 0; f < nf; f++) {
        const int *v = faces + 3 * (size_t)f;
        double     e[2][3], m[3];
        for (k = 0; k < 2; k++)
            kdsmi_sub(x + 3 * (size_t)v[k + 1], x + 3 * (size_t)v[0], e[k]);
        kdsmi_cross(e[0], e[1], m);
        for (k = 0; k < 3; k++)
            for (c = 0; c < 3; c++) n[3 * (size_t)v[k] + (size_t)c] += m[c];
    }
    for (f = 0; f < nv; f++) {
        const double l = sqrt(kdsmi_dot(n + 3 * (size_t)f, n + 3 * (size_t)f));
        for (c = 0; c < 3 && l > 0; c++) n[3 * (size_t)f + (size_t)c] /= l;
    }
}

/* Weight w of joint j into the `kept` largest so far of a vertex; returns what falls out. */
static double kdsmi_insert(int kept, int *joint, double *weight, int j, double w) {
    int i;
    for (i = 0; i < kept; i++)
        if (w > weight[i]) {
            const double old = weight[i];
            const int    was = joint[i];
            weight[i] = w, joint[i] = j;
            w = old, j = was;
        }
    return w;
}

/* a [nv] as above, and the number of tetrahedra at each vertex. */
static void kdsmi_shares(const kdsmi_space *s, double smooth, int sweeps, int *count, double *a) {
    const kdsm_space *p = &s->pub;
    int               i, e, k;
    for (i = 0; i < p->nt; i++)
        for (e = 0; e < 6; e++)
            for (k = 0; k < 2; k++) {
                const int *v = p->tet + 4 * (size_t)i, end = v[kdsmi_edge[e][k]];
                const int  other = v[kdsmi_edge[e][1 - k]];
                a[end] += kdsmi_distance2(p->v + 3 * (size_t)end, p->v + 3 * (size_t)other);
                count[end]++;
            }
    for (i = 0; i < p->nv; i++) {
        const double far = p->phi[i] / s->near;
        a[i] = fmin(0.5, 3 * smooth * smooth * count[i] / (sweeps * a[i])) * fmin(1, far * far);
    }
}

/* One sweep over one joint's column, from -> to [nv]. */
static void kdsmi_sweep(const kdsm_space *p, const int *count, const double *a,
                        const double *from, double *to) {
    int i, k;
    memset(to, 0, (size_t)p->nv * sizeof(double));
    for (i = 0; i < p->nt; i++) {
        const int   *v = p->tet + 4 * (size_t)i;
        const double all = from[v[0]] + from[v[1]] + from[v[2]] + from[v[3]];
        for (k = 0; k < 4; k++) to[v[k]] += all - from[v[k]];
    }
    for (i = 0; i < p->nv; i++) to[i] = (1 - a[i]) * from[i] + a[i] * to[i] / count[i];
}

/* Weights of joint j at the body's points nearest to the vertices: column [nv]; 0: all are 0. */
static int kdsmi_column(const kdsmi_space *s, const int *face, const double *bary, int j,
                        double *column) {
    int i, k, c, any = 0;
    for (i = 0; i < s->pub.nv; i++)
        for (column[i] = 0, c = 0; c < 3; c++) {
            const size_t v = (size_t)s->influences * (size_t)s->bf[3 * (size_t)face[i] + (size_t)c];
            for (k = 0; k < s->influences; k++)
                if (s->bj[v + (size_t)k] == j && s->bw[v + (size_t)k] > 0)
                    column[i] += bary[3 * i + c] * s->bw[v + (size_t)k], any = 1;
        }
    return any;
}

static cloth_status kdsmi_weights(kdsmi_space *s, const kdsm_desc *d) {
    kdsm_space   *p = &s->pub;
    const size_t  nv = (size_t)p->nv, kept = (size_t)p->kept;
    kdsmi_surface body;
    kdsmi_tree    tree;
    double       *bary = (double *)kdsmi_alloc(&s->hooks, nv, 6 * sizeof(double));
    int          *face = (int *)kdsmi_alloc(&s->hooks, nv, 2 * sizeof(int)), j, k, i;
    const double  fine = d->coarse / (1 << d->levels), steps = d->smooth / fine;
    const int     sweeps = (int)ceil(6 * steps * steps);
    cloth_status  status = CLOTH_OK;
    memset(&tree, 0, sizeof tree);
    body.x = s->bx, body.faces = s->bf;
    p->joint = (int *)kdsmi_alloc(&s->hooks, nv * kept, sizeof(int));
    p->weight = (double *)kdsmi_alloc(&s->hooks, nv * kept, sizeof(double));
    if (!bary || !face || !p->joint || !p->weight || !kdsmi_tree_make(&s->hooks, s->fb, &tree)) {
        status = kdsmi_no_memory(&s->hooks, "weights");
        goto done;
    }
    kdsmi_surface_boxes(&tree, s->bx, s->bf);
    kdsmi_tree_build(&tree);
    for (i = 0; i < p->nv; i++)
        face[i] = kdsmi_surface_nearest(&tree, &body, p->v + 3 * i, bary + 3 * i);
    kdsmi_shares(s, d->smooth, sweeps, face + nv, bary + 5 * nv);
    for (j = 0; j < p->njoints; j++) {
        double *from = bary + 3 * nv, *to = from + nv;
        if (!kdsmi_column(s, face, bary, j, from)) continue;
        for (k = 0; k < sweeps; k++) {
            double *swap = from;
            kdsmi_sweep(p, face + nv, bary + 5 * nv, from, to);
            from = to, to = swap;
        }
        for (i = 0; i < p->nv; i++)
            p->report.cut = fmax(p->report.cut, kdsmi_insert(p->kept, p->joint + kept * (size_t)i,
                                                             p->weight + kept * (size_t)i, j,
                                                             from[i]));
    }
    for (i = 0; i < p->nv; i++) {
        double *w = p->weight + kept * (size_t)i, sum = 0;
        for (k = 0; k < p->kept; k++) sum += w[k];
        for (k = 0; k < p->kept; k++) w[k] /= sum;
    }
done:
    kdsmi_tree_free(&s->hooks, &tree);
    kdsmi_free(&s->hooks, face), kdsmi_free(&s->hooks, bary);
    return status;
}

/* x [n x 3] of places p, `k` joints and weights each, under T; list [n] or NULL: all. */
static void kdsmi_blend(const double *p, int k, const int *joint, const double *weight,
                        const double *T, int n, const int *list, double *x) {
    int i, j, a, r;
    for (i = 0; i < n; i++) {
        const size_t  v = list ? (size_t)list[i] : (size_t)i, at = v * (size_t)k;
        const double *q = p + 3 * v;
        double        M[12];
        memset(M, 0, sizeof M);
        for (j = 0; j < k; j++) {
            const double  w = weight[at + (size_t)j];
            const double *R = T + 12 * (size_t)joint[at + (size_t)j];
            for (a = 0; a < 12 && w > 0; a++) M[a] += w * R[a];
        }
        for (r = 0; r < 3; r++)
            x[3 * v + (size_t)r] = M[4 * r] * q[0] + M[4 * r + 1] * q[1] + M[4 * r + 2] * q[2]
                                   + M[4 * r + 3];
    }
}

/* ===== [4.4] QUALITY ========================================================================= */

/* Degrees between the faces that meet in edge a b, c and d across from it. */
static double kdsmi_dihedral(const double *a, const double *b, const double *c, const double *d) {
    double e[3], f[3], g[3], m[3], n[3], t[3];
    kdsmi_sub(b, a, e), kdsmi_sub(c, a, f), kdsmi_sub(d, a, g);
    kdsmi_cross(e, f, m), kdsmi_cross(e, g, n), kdsmi_cross(m, n, t);
    return atan2(sqrt(kdsmi_dot(t, t)), kdsmi_dot(m, n)) * 57.295779513082323;
}

KDSM_API kdsm_quality kdsm_measure(const kdsm_space *space, const double *x) {
    kdsm_quality q;
    int          i, e, k, good = 0;
    memset(&q, 0, sizeof q);
    if (!space) return q;
    q.smallest = q.angle_min = HUGE_VAL, q.largest = -HUGE_VAL;
    for (i = 0; i < space->nt; i++) {
        double a[12], n[3][3], det, area = 0, aspect;
        kdsmi_corners(x ? x : space->v, space->tet + 4 * (size_t)i, a);
        det = kdsmi_det(a, n);
        q.volume += det / 6, q.smallest = fmin(q.smallest, det / 6);
        q.largest = fmax(q.largest, det / 6);
        q.inverted += !(det > 0);
        if (!(det > 0)) continue;
        for (e = 0; e < 6; e++) {
            const int    *c = kdsmi_edge[e], *o = kdsmi_edge[5 - e];
            const double  angle = kdsmi_dihedral(a + 3 * c[0], a + 3 * c[1], a + 3 * o[0],
                                                 a + 3 * o[1]);
            q.angle_min = fmin(q.angle_min, angle), q.angle_max = fmax(q.angle_max, angle);
        }
        for (k = 0; k < 4; k++) {           /* twice the largest face: det / it is the height */
            double u[3], v[3], m[3];
            kdsmi_sub(a + 3 * ((k + 1) % 4), a + 3 * k, u);
            kdsmi_sub(a + 3 * ((k + 2) % 4), a + 3 * k, v);
            kdsmi_cross(u, v, m);
            area = fmax(area, sqrt(kdsmi_dot(m, m)));
        }
        aspect = sqrt(kdsmi_longest2(a)) * area / det * 0.81649658092772603;
        q.aspect = fmax(q.aspect, aspect), q.aspect_mean += aspect, good++;
    }
    if (good) q.aspect_mean /= good;
    return q;
}

/* ===== [5.1] THE SPACE ======================================================================= */

#define KDSMI_COOKIE 0x6d73646bu

KDSM_API kdsm_desc kdsm_desc_default(void) {
    kdsm_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = KDSMI_COOKIE;
    d.coarse = KDSM_DEFAULT_COARSE, d.levels = KDSM_DEFAULT_LEVELS;
    d.thickness = KDSM_DEFAULT_THICKNESS, d.near = KDSM_DEFAULT_NEAR;
    d.smooth = KDSM_DEFAULT_SMOOTH, d.kept = KDSM_DEFAULT_KEPT, d.epsilon = KDSM_DEFAULT_EPSILON;
    return d;
}

/* Every number of the desc; what faces and x must be is for the distance grid to say. */
static cloth_status kdsmi_check_numbers(const kdsm_desc *d) {
    const double fine = d->levels >= 0 && d->levels <= 6 ? d->coarse / (1 << d->levels) : 0;
    const struct {
        const char *name;
        double      value, least, most;
    } of[] = {{"nv", (double)d->nv, 4, CLOTH_MAX_COUNT}, {"nf", (double)d->nf, 4, CLOTH_MAX_COUNT},
              {"njoints", (double)d->njoints, 1, 65536},
              {"influences", (double)d->influences, 1, 64},
              {"coarse", d->coarse, 1e-9, 1e9},          {"levels", (double)d->levels, 0, 6},
              {"thickness", d->thickness, 1e-9, 1e9},    {"near", d->near, 1e-9, d->thickness},
              {"cell", d->cell, 0, 1e9},                 {"smooth", d->smooth, 0, 16 * fine},
              {"kept", (double)d->kept, 1, 64},          {"epsilon", d->epsilon, 0, 1}};
    size_t i;
    for (i = 0; i < sizeof of / sizeof *of; i++) {
        if (!kdsmi_finite(of[i].value))
            return kdsmi_fail(&d->hooks, CLOTH_ERR_NONFINITE, "desc.%s = %g", of[i].name,
                              of[i].value);
        if (!(of[i].value >= of[i].least && of[i].value <= of[i].most))
            return kdsmi_fail(&d->hooks, CLOTH_ERR_ARGUMENT, "desc.%s = %g is not in %g .. %g",
                              of[i].name, of[i].value, of[i].least, of[i].most);
    }
    return CLOTH_OK;
}

static cloth_status kdsmi_check_weights(const kdsm_desc *d) {
    const int k = d->influences;
    int       i, j;
    if (!d->joint || !d->weight)
        return kdsmi_fail(&d->hooks, CLOTH_ERR_ARGUMENT, "desc.%s is NULL",
                          d->joint ? "weight" : "joint");
    for (i = 0; i < d->nv; i++) {
        double sum = 0;
        for (j = 0; j < k; j++) {
            const size_t at = (size_t)i * (size_t)k + (size_t)j;
            if (!kdsmi_finite(d->weight[at]))
                return kdsmi_fail(&d->hooks, CLOTH_ERR_NONFINITE, "desc.weight[%lu] = %g",
                                  (unsigned long)at, d->weight[at]);
            if (d->weight[at] < 0 || d->joint[at] < 0 || d->joint[at] >= d->njoints)
                return kdsmi_fail(&d->hooks, CLOTH_ERR_ARGUMENT, "desc.joint[%lu] = %d, weight %g:"
                                  " njoints = %d", (unsigned long)at, d->joint[at], d->weight[at],
                                  d->njoints);
            sum += d->weight[at];
        }
        if (!(sum > 1e-9) || !kdsmi_finite(sum))
            return kdsmi_fail(&d->hooks, CLOTH_ERR_ARGUMENT, "the weights of vertex %d have the "
                              "sum %g", i, sum);
    }
    return CLOTH_OK;
}

/* The body's own copy: weights scaled to sum 1, normals. */
static cloth_status kdsmi_take_body(kdsmi_space *s, const kdsm_desc *d) {
    const size_t nv = (size_t)d->nv, all = nv * (size_t)d->influences;
    size_t       i, j, k = (size_t)d->influences;
    s->nb = d->nv, s->fb = d->nf, s->influences = d->influences;
    s->bx = (double *)kdsmi_copy(&s->hooks, d->x, 3 * nv, sizeof(double));
    s->bf = (int *)kdsmi_copy(&s->hooks, d->faces, 3 * (size_t)d->nf, sizeof(int));
    s->bj = (int *)kdsmi_copy(&s->hooks, d->joint, all, sizeof(int));
    s->bw = (double *)kdsmi_copy(&s->hooks, d->weight, all, sizeof(double));
    s->bn = (double *)kdsmi_alloc(&s->hooks, 3 * nv, sizeof(double));
    if (!s->bx || !s->bf || !s->bj || !s->bw || !s->bn)
        return kdsmi_no_memory(&s->hooks, "the body");
    kdsmi_normals(s->nb, s->bx, s->fb, s->bf, s->bn);
    for (i = 0; i < nv; i++) {
        double sum = 0;
        for (j = 0; j < k; j++) sum += s->bw[i * k + j];
        for (j = 0; j < k; j++) s->bw[i * k + j] /= sum;
    }
    return CLOTH_OK;
}

/* The distance grid: exact as far as any tetrahedron of the lattice can ask. */
static cloth_status kdsmi_make_grid(const kdsm_desc *d, cloth_grid **out) {
    cloth_grid_desc g = cloth_grid_desc_default();
    g.hooks = d->hooks;
    g.nv = d->nv, g.x = d->x, g.nf = d->nf, g.faces = d->faces;
    g.cell = d->cell > 0 ? d->cell : 0.5 * d->coarse / (1 << d->levels);
    g.band = d->thickness + d->coarse + 2 * g.cell;
    return cloth_grid_create(&g, out);
}

/* The mesh out of the grid. */
static cloth_status kdsmi_make_mesh(kdsmi_space *s, const kdsm_desc *d, const cloth_grid *grid) {
    kdsmi_maker  m;
    cloth_status status;
    int          i;
    memset(&m, 0, sizeof m);
    m.d = d, m.grid = grid, m.rep = &s->pub.report;
    status = kdsmi_lattice(&m);
    if (!status) status = kdsmi_refine(&m);
    if (!status) status = kdsmi_close(&m);
    if (!status) status = kdsmi_emit(&m, &s->pub);
    kdsmi_maker_free(&m);
    if (status) return status;
    s->pub.phi = (double *)kdsmi_alloc(&s->hooks, (size_t)s->pub.nv, sizeof(double));
    if (!s->pub.phi) return kdsmi_no_memory(&s->hooks, "distances");
    for (i = 0; i < s->pub.nv; i++) s->pub.phi[i] = kdsmi_phi(grid, s->pub.v + 3 * (size_t)i, 0);
    return CLOTH_OK;
}

static void kdsmi_tet_boxes(kdsmi_tree *t, const kdsmi_space *s, const double *x);

KDSM_API cloth_status kdsm_create(const kdsm_desc *desc, kdsm_space **out) {
    kdsmi_space *s = NULL;
    cloth_grid  *grid = NULL;
    cloth_status status;
    double       t0;
    if (out) *out = NULL;
    if (!out || !desc) return CLOTH_ERR_ARGUMENT;
    if (desc->cookie != KDSMI_COOKIE) return CLOTH_ERR_UNINIT;
    status = kdsmi_check_numbers(desc);
    if (!status) status = kdsmi_check_weights(desc);
    if (status) return status;
    t0 = kdsmi_now(&desc->hooks);
    status = kdsmi_make_grid(desc, &grid);
    if (status) return status;
    s = (kdsmi_space *)kdsmi_alloc(&desc->hooks, 1, sizeof *s);
    if (!s) {
        status = kdsmi_no_memory(&desc->hooks, "a space");
        goto done;
    }
    s->hooks = desc->hooks, s->epsilon = desc->epsilon, s->near = desc->near;
    s->pub.njoints = desc->njoints, s->pub.kept = desc->kept;
    s->pub.report.ms_grid = kdsmi_now(&s->hooks) - t0, t0 = kdsmi_now(&s->hooks);
    status = kdsmi_take_body(s, desc);
    if (!status) status = kdsmi_make_mesh(s, desc, grid);
    s->pub.report.ms_mesh = kdsmi_now(&s->hooks) - t0, t0 = kdsmi_now(&s->hooks);
    if (!status) status = kdsmi_weights(s, desc);
    s->pub.report.ms_weights = kdsmi_now(&s->hooks) - t0;
    if (!status && !kdsmi_tree_make(&s->hooks, s->pub.nt, &s->tree))
        status = kdsmi_no_memory(&s->hooks, "the hierarchy");
    if (!status) {
        kdsmi_tet_boxes(&s->tree, s, s->pub.v);
        kdsmi_tree_build(&s->tree);
        *out = &s->pub;
    }
done:
    cloth_grid_destroy(grid);
    if (status && s) kdsm_destroy(&s->pub);
    return status;
}

KDSM_API void kdsm_destroy(kdsm_space *space) {
    kdsmi_space *s = (kdsmi_space *)(void *)space;
    cloth_hooks  hooks;
    if (!s) return;
    hooks = s->hooks;
    kdsmi_free(&hooks, space->v), kdsmi_free(&hooks, space->tet), kdsmi_free(&hooks, space->green);
    kdsmi_free(&hooks, space->phi), kdsmi_free(&hooks, space->joint);
    kdsmi_free(&hooks, space->weight), kdsmi_free(&hooks, s->bx), kdsmi_free(&hooks, s->bw);
    kdsmi_free(&hooks, s->bn), kdsmi_free(&hooks, s->bf), kdsmi_free(&hooks, s->bj);
    kdsmi_tree_free(&hooks, &s->tree);
    kdsmi_free(&hooks, s);
}

static const kdsmi_space *kdsmi_of(const kdsm_space *space) {
    return (const kdsmi_space *)(const void *)space;
}

KDSM_API cloth_status kdsm_skin(const kdsm_space *space, const double *T, int n, const int *list,
                                double *x) {
    cloth_status status;
    int          i;
    if (!space || !x || n < 0) return CLOTH_ERR_ARGUMENT;
    status = kdsmi_check(&kdsmi_of(space)->hooks, "T", T, 12 * (size_t)space->njoints);
    for (i = 0; !status && list && i < n; i++)
        if (list[i] < 0 || list[i] >= space->nv)
            status = kdsmi_fail(&kdsmi_of(space)->hooks, CLOTH_ERR_ARGUMENT, "list[%d] = %d but "
                                "the space has %d vertices", i, list[i], space->nv);
    if (!status)
        kdsmi_blend(space->v, space->kept, space->joint, space->weight, T,
                    list ? n : space->nv, list, x);
    return status;
}

/* ===== [5.2] POSES, POINTS IN THEM ===========================================================
 *
 *      ____                    A pose may lay space over itself: p is in the tetrahedra of the arm
 *     /arm_\__                 and in those of the trunk, or in one that was turned inside out.
 *     \  p_/--\ trunk          Barycentric coordinates do not care about the sign of the volume:
 *      \/ |    |               p is inside where all four are >= 0. The margin epsilon finds p also
 *                              in tetrahedra beside it, where rounding or a fold left a gap.
 *
 * { w >= -epsilon } is the tetrahedron grown by 1 + 4 epsilon about its middle: its box is what the
 * hierarchy keeps, a millionth larger, so that rounding loses nobody. Of those found the deepest is
 * taken, and all behind it are struck out that share a vertex with the face across from its vertex
 * of the smallest weight: where p is near a face, an edge or a vertex, those around that hold the
 * same piece of space. Then the next that is left, and so on.
 *
 * checked: tests/test_kdsm.c: locate_is_brute_force */

static void kdsmi_tet_boxes(kdsmi_tree *t, const kdsmi_space *s, const double *x) {
    int i, k;
    for (i = 0; i < t->n; i++) {
        const int *v = s->pub.tet + 4 * (size_t)i;
        double     a[12], wide = 0;
        kdsmi_corners(x, v, a);
        kdsmi_box(x, v, 4, t->box[i]);
        for (k = 0; k < 3; k++) {           /* of a grown corner: (1 + 4 e) (v - m) + m */
            const double m = 0.25 * (a[k] + a[k + 3] + a[k + 6] + a[k + 9]);
            wide = fmax(wide, t->box[i][k + 3] - t->box[i][k]);
            t->box[i][k] += 4 * s->epsilon * (t->box[i][k] - m);
            t->box[i][k + 3] += 4 * s->epsilon * (t->box[i][k + 3] - m);
        }
        for (k = 0; k < 3; k++) t->box[i][k] -= 1e-6 * wide, t->box[i][k + 3] += 1e-6 * wide;
    }
}

typedef struct kdsmi_pose {
    kdsm_pose   pub;
    kdsmi_tree  tree, faces;                /* of tetrahedra, of the body's faces              */
    double     *normal;                     /* [body nv x 3]                                   */
    kdsmi_list  found;                      /* kdsm_candidate                                  */
} kdsmi_pose;

/* What follows x and the body's x; grow: builds or refits the hierarchies. */
static void kdsmi_pose_refresh(kdsmi_pose *p, void (*grow)(kdsmi_tree *t)) {
    const kdsmi_space *s = kdsmi_of(p->pub.space);
    kdsmi_tet_boxes(&p->tree, s, p->pub.x);
    grow(&p->tree);
    kdsmi_surface_boxes(&p->faces, p->pub.body, s->bf);
    grow(&p->faces);
    kdsmi_normals(s->nb, p->pub.body, s->fb, s->bf, p->normal);
}

KDSM_API cloth_status kdsm_pose_create(const kdsm_space *space, kdsm_pose **out) {
    const kdsmi_space *s = kdsmi_of(space);
    const cloth_hooks *hooks;
    kdsmi_pose        *p;
    int                ok;
    if (out) *out = NULL;
    if (!out || !space) return CLOTH_ERR_ARGUMENT;
    hooks = &s->hooks;
    p = (kdsmi_pose *)kdsmi_alloc(hooks, 1, sizeof *p);
    if (!p) return kdsmi_no_memory(hooks, "a pose");
    p->pub.space = space;
    p->pub.x = (double *)kdsmi_copy(hooks, space->v, 3 * (size_t)space->nv, sizeof(double));
    p->pub.body = (double *)kdsmi_copy(hooks, s->bx, 3 * (size_t)s->nb, sizeof(double));
    p->normal = (double *)kdsmi_alloc(hooks, 3 * (size_t)s->nb, sizeof(double));
    ok = kdsmi_tree_make(hooks, space->nt, &p->tree) && kdsmi_tree_make(hooks, s->fb, &p->faces);
    if (!ok || !p->pub.x || !p->pub.body || !p->normal) {
        kdsm_pose_destroy(&p->pub);
        return kdsmi_no_memory(hooks, "a pose");
    }
    kdsmi_pose_refresh(p, kdsmi_tree_build);
    *out = &p->pub;
    return CLOTH_OK;
}

KDSM_API void kdsm_pose_destroy(kdsm_pose *pose) {
    kdsmi_pose        *p = (kdsmi_pose *)(void *)pose;
    const cloth_hooks *hooks;
    if (!p) return;
    hooks = &kdsmi_of(pose->space)->hooks;
    kdsmi_tree_free(hooks, &p->tree), kdsmi_tree_free(hooks, &p->faces);
    kdsmi_free(hooks, pose->x), kdsmi_free(hooks, pose->body), kdsmi_free(hooks, p->normal);
    kdsmi_free(hooks, p->found.at);
    kdsmi_free(hooks, p);
}

KDSM_API cloth_status kdsm_pose_set(kdsm_pose *pose, const double *T) {
    const kdsmi_space *s;
    cloth_status       status;
    if (!pose) return CLOTH_ERR_ARGUMENT;
    s = kdsmi_of(pose->space);
    status = kdsm_skin(pose->space, T, s->pub.nv, NULL, pose->x);
    if (status) return status;
    kdsmi_blend(s->bx, s->influences, s->bj, s->bw, T, s->nb, NULL, pose->body);
    kdsmi_pose_refresh((kdsmi_pose *)(void *)pose, kdsmi_tree_refit);
    return CLOTH_OK;
}

/* p in tetrahedron i of positions x, or no depth at all. */
static int kdsmi_inside(const kdsm_space *s, const double *x, int i, const double *p,
                        kdsm_candidate *c) {
    double a[12];
    kdsmi_corners(x, s->tet + 4 * (size_t)i, a);
    if (!kdsm_barycentric(a, p, c->w)) return 0;
    c->tet = i;
    c->depth = fmin(fmin(c->w[0], c->w[1]), fmin(c->w[2], c->w[3]));
    return 1;
}

static int kdsmi_deeper(const kdsm_candidate *a, const kdsm_candidate *b) {
    return a->depth > b->depth || (!(a->depth < b->depth) && a->tet < b->tet);
}

/* Do the tetrahedra of a and b share a vertex that is not across from a's nearest face? */
static int kdsmi_beside(const kdsm_space *s, const kdsm_candidate *a, const kdsm_candidate *b) {
    int across = 0, i, j;
    for (i = 1; i < 4; i++) across = a->w[i] < a->w[across] ? i : across;
    for (i = 0; i < 4; i++)
        for (j = 0; j < 4 && i != across; j++)
            if (s->tet[4 * (size_t)a->tet + (size_t)i] == s->tet[4 * (size_t)b->tet + (size_t)j])
                return 1;
    return 0;
}

/* Candidates of p into pose->found, sorted and pruned; *held before pruning. */
static cloth_status kdsmi_find(kdsmi_pose *pose, const double *p, int *held) {
    const kdsm_space *s = pose->pub.space;
    kdsm_candidate    c, *list;
    kdsmi_walk        walk;
    size_t            i, j, n;
    int               t;
    pose->found.n = 0;
    kdsmi_walk_start(&walk, &pose->tree);
    while ((t = kdsmi_walk_next(&walk, p)) >= 0) {
        if (!kdsmi_inside(s, pose->pub.x, t, p, &c) || c.depth < -kdsmi_of(s)->epsilon) continue;
        if (!kdsmi_push(&kdsmi_of(s)->hooks, &pose->found, sizeof c))
            return kdsmi_no_memory(&kdsmi_of(s)->hooks, "candidates");
        list = (kdsm_candidate *)pose->found.at;
        for (i = pose->found.n - 1; i > 0 && kdsmi_deeper(&c, list + i - 1); i--)
            list[i] = list[i - 1];
        list[i] = c;
    }
    list = (kdsm_candidate *)pose->found.at;
    *held = (int)pose->found.n;
    for (i = 0; i < pose->found.n; i++) {
        for (n = j = i + 1; j < pose->found.n; j++)
            if (!kdsmi_beside(s, list + i, list + j)) list[n++] = list[j];
        pose->found.n = n;
    }
    return CLOTH_OK;
}

KDSM_API cloth_status kdsm_locate(kdsm_pose *pose, const double p[3], int max,
                                  kdsm_candidate *out, int *count, int *held) {
    kdsmi_pose  *q = (kdsmi_pose *)(void *)pose;
    int          all = 0;
    cloth_status status;
    if (count) *count = 0;
    if (held) *held = 0;
    if (!pose || !count || max < 0 || (max > 0 && !out)) return CLOTH_ERR_ARGUMENT;
    status = kdsmi_check(&kdsmi_of(pose->space)->hooks, "p", p, 3);
    if (!status) status = kdsmi_find(q, p, &all);
    if (status) return status;
    *count = (int)q->found.n;
    if (held) *held = all;
    if (*count && max > 0)
        memcpy(out, q->found.at, (size_t)(max < *count ? max : *count) * sizeof *out);
    return CLOTH_OK;
}

/* x over the body of pose p to the same place over another one, of vertices v and normals vn: the
 * nearest point, and as far along the normal there. */
static void kdsmi_over(const kdsmi_pose *p, const double *v, const double *vn, const double *x,
                       double *out) {
    const kdsmi_space *s = kdsmi_of(p->pub.space);
    kdsmi_surface      body;
    double             w[3], q[3] = {0, 0, 0}, n[3] = {0, 0, 0}, n1[3] = {0, 0, 0}, l, l1, off = 0;
    double             to[3] = {0, 0, 0};   /* out may be x */
    int                f, k, a;
    body.x = p->pub.body, body.faces = s->bf;
    f = kdsmi_surface_nearest(&p->faces, &body, x, w);
    for (k = 0; k < 3; k++) {
        const size_t at = 3 * (size_t)s->bf[3 * (size_t)f + (size_t)k];
        for (a = 0; a < 3; a++) {
            q[a] += w[k] * p->pub.body[at + (size_t)a], to[a] += w[k] * v[at + (size_t)a];
            n[a] += w[k] * p->normal[at + (size_t)a], n1[a] += w[k] * vn[at + (size_t)a];
        }
    }
    l = sqrt(kdsmi_dot(n, n)), l1 = sqrt(kdsmi_dot(n1, n1));
    for (a = 0; a < 3 && l > 0; a++) off += (x[a] - q[a]) * n[a] / l;
    for (a = 0; a < 3; a++) out[a] = to[a] + (l1 > 0 ? off * n1[a] / l1 : 0);
}

KDSM_API cloth_status kdsm_carry(const kdsm_pose *from, const kdsm_pose *to, int n, const double *x,
                                 double *out) {
    const kdsmi_pose  *p = (const kdsmi_pose *)(const void *)from;
    const kdsmi_pose  *q = (const kdsmi_pose *)(const void *)to;
    const cloth_hooks *hooks;
    cloth_status       status;
    int                i;
    if (!from || !to || !out) return CLOTH_ERR_ARGUMENT;
    hooks = &kdsmi_of(from->space)->hooks;
    if (from->space != to->space || n < 0)
        return kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "to carry n = %d points%s", n,
                          from->space != to->space ? " to a pose of another space" : "");
    status = kdsmi_check(hooks, "x", x, 3 * (size_t)n);
    for (i = 0; i < n && !status; i++)
        kdsmi_over(p, q->pub.body, q->normal, x + 3 * (size_t)i, out + 3 * (size_t)i);
    return status;
}

/* ===== [6.1] EMBEDDING =======================================================================
 *
 * At rest no tetrahedron overlaps another: a point is in one, or on the face of two, where both say
 * the same. Outside the nearest one goes on by its own linear map: continuous at the border.
 *
 *     dx/du = sum_k v_k(T) (grad L_k)' = [e1' e2' e3'] [e1 e2 e3]^-1      e_k = v_k - v_0, posed '
 *
 * checked: tests/test_kdsm.c: embedding_gives_points_back, derivative_by_central_differences */

/* Squared distance from p to a tetrahedron at rest. */
static double kdsmi_rest_far(int i, const double *p, const void *ctx) {
    const kdsm_space *s = (const kdsm_space *)ctx;
    kdsm_candidate    c;
    double            a[12], w[3], best = HUGE_VAL;
    int               k;
    if (kdsmi_inside(s, s->v, i, p, &c) && c.depth >= 0) return 0;
    kdsmi_corners(s->v, s->tet + 4 * (size_t)i, a);
    for (k = 0; k < 4; k++)
        best = fmin(best, kdsmi_triangle2(p, a + 3 * ((k + 1) % 4), a + 3 * ((k + 2) % 4),
                                          a + 3 * ((k + 3) % 4), w));
    return best;
}

/* The deepest tetrahedron at rest, or the nearest; returns the distance, 0 inside. */
static double kdsmi_embed(const kdsm_space *s, const double *p, kdsm_candidate *best) {
    kdsmi_walk     walk;
    kdsm_candidate c;
    double         far2 = 0;
    int            t;
    best->tet = -1, best->depth = 0;
    kdsmi_walk_start(&walk, &kdsmi_of(s)->tree);
    while ((t = kdsmi_walk_next(&walk, p)) >= 0)
        if (kdsmi_inside(s, s->v, t, p, &c) && c.depth >= 0
            && (best->tet < 0 || kdsmi_deeper(&c, best))) *best = c;
    if (best->tet >= 0) return 0;
    t = kdsmi_tree_nearest(&kdsmi_of(s)->tree, p, kdsmi_rest_far, s, &far2);
    (void)kdsmi_inside(s, s->v, t, p, best);
    return sqrt(far2);
}

KDSM_API cloth_status kdsm_embed(const kdsm_space *space, int n, const double *u, int *tet,
                                 double *w, int *outside, double *farthest) {
    cloth_status status;
    double       most = 0;
    int          i, out = 0;
    if (!space || n < 0 || !tet || !w) return CLOTH_ERR_ARGUMENT;
    status = kdsmi_check(&kdsmi_of(space)->hooks, "u", u, 3 * (size_t)n);
    for (i = 0; i < n && !status; i++) {
        kdsm_candidate c;
        const double   far = kdsmi_embed(space, u + 3 * (size_t)i, &c);
        out += far > 0, most = fmax(most, far);
        tet[i] = c.tet;
        memcpy(w + 4 * (size_t)i, c.w, sizeof c.w);
    }
    if (outside) *outside = out;
    if (farthest) *farthest = most;
    return status;
}

/* Do tet [n] name tetrahedra of the space? */
static cloth_status kdsmi_check_tets(const kdsm_space *s, int n, const int *tet) {
    int i;
    for (i = 0; i < n; i++)
        if (tet[i] < 0 || tet[i] >= s->nt)
            return kdsmi_fail(&kdsmi_of(s)->hooks, CLOTH_ERR_ARGUMENT, "tet[%d] = %d but the space"
                              " has %d", i, tet[i], s->nt);
    return CLOTH_OK;
}

KDSM_API cloth_status kdsm_needed(const kdsm_space *space, int n, const int *tet, int *list,
                                  int *count) {
    unsigned char *mark;
    cloth_status   status;
    int            i;
    if (count) *count = 0;
    if (!space || n < 0 || !tet || !list || !count) return CLOTH_ERR_ARGUMENT;
    status = kdsmi_check_tets(space, n, tet);
    if (status) return status;
    mark = (unsigned char *)kdsmi_alloc(&kdsmi_of(space)->hooks, (size_t)space->nv, 1);
    if (!mark) return kdsmi_no_memory(&kdsmi_of(space)->hooks, "marks");
    for (i = 0; i < 4 * n; i++) mark[space->tet[4 * (size_t)tet[i / 4] + (size_t)(i % 4)]] = 1;
    for (i = 0; i < space->nv; i++)
        if (mark[i]) list[(*count)++] = i;
    kdsmi_free(&kdsmi_of(space)->hooks, mark);
    return CLOTH_OK;
}

/* F [9] of tetrahedron t at positions xv. */
static void kdsmi_gradient(const kdsm_space *s, const double *xv, int t, double *F) {
    double       a[12], b[12], n[3][3], det;
    int          r, c, k;
    kdsmi_corners(s->v, s->tet + 4 * (size_t)t, a);
    kdsmi_corners(xv, s->tet + 4 * (size_t)t, b);
    det = kdsmi_det(a, n);
    for (r = 0; r < 3; r++)
        for (c = 0; c < 3; c++)
            for (F[3 * r + c] = 0, k = 0; k < 3; k++)
                F[3 * r + c] += (b[3 * (k + 1) + r] - b[r]) * n[k][c] / det;
}

KDSM_API cloth_status kdsm_evaluate(const kdsm_space *space, const double *xv, int n,
                                    const int *tet, const double *w, double *x, double *F) {
    cloth_status status;
    int          i, k, c;
    if (!space || !xv || n < 0 || !tet || !w || !x) return CLOTH_ERR_ARGUMENT;
    status = kdsmi_check_tets(space, n, tet);
    for (i = 0; i < n && !status; i++) {
        const int *v = space->tet + 4 * (size_t)tet[i];
        double     sum[3] = {0, 0, 0};
        for (k = 0; k < 4; k++)
            for (c = 0; c < 3; c++)
                sum[c] += w[4 * (size_t)i + (size_t)k] * xv[3 * (size_t)v[k] + (size_t)c];
        memcpy(x + 3 * (size_t)i, sum, sizeof sum);
        if (F) kdsmi_gradient(space, xv, tet[i], F + 9 * (size_t)i);
    }
    return status;
}

/* ===== [6.2] DISPLACEMENTS ===================================================================
 *
 * Given where a vertex is, x, which place um at rest is meant? Each candidate [5.2] offers one that
 * gives x back to rounding; with several, a wrong choice makes a d that jumps from vertex to vertex
 * and from pose to pose, and no network learns that.
 *
 *   method 1   one of them at random
 *   method 2   none of them: q the nearest point of the posed body, s = (x - q).n along its normal;
 *              um = q at rest + s n at rest. Smooth, but it does not know what is between
 *   hybrid     one candidate: that. Several: the one whose um is next to method 2's, where within
 *              `accept`. The others: e = um - um2 is known at the rest of the cloth; the Laplace
 *              equation of the cloth carries it on,
 *
 *                  sum_j c_ij (e_i - e_j) = 0  at unknown i,   c = (cot a + cot b)/2, at least 0.05
 *
 *              and where |e| < accept, and a candidate is that near to um2 + e, it is taken. So
 *              round after round while any is; what is left takes um2 + e.
 *
 * Candidates that only the margin epsilon finds serve where there is no other. A part of the cloth
 * in which nothing is known keeps e = 0: the matrix has 1e-9 added.
 *
 * checked: tests/test_kdsm.c: round_trip_*, surface_*, hybrid_*, orders_of_the_paper */

typedef struct kdsmi_cloth {
    kdsm_cloth     pub;
    cloth_pattern *pattern;                 /* of c_ij                                         */
    cloth_matrix  *laplace;
    cloth_factor  *factor;
} kdsmi_cloth;

/* c_ij of one face into H [9 x 9]: three equal unknowns a vertex. */
static void kdsmi_laplace(const double *u, const int *f, double *H) {
    int k, c;
    memset(H, 0, 81 * sizeof(double));
    for (k = 0; k < 3; k++) {               /* the angle at k counts for the edge across */
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        double    a[3], b[3], n[3], l, cot;
        kdsmi_sub(u + 3 * (size_t)f[i], u + 3 * (size_t)f[k], a);
        kdsmi_sub(u + 3 * (size_t)f[j], u + 3 * (size_t)f[k], b);
        kdsmi_cross(a, b, n);
        l = sqrt(kdsmi_dot(n, n));
        cot = l > 0 ? kdsmi_dot(a, b) / l : 0;
        cot = 0.5 * fmin(fmax(cot, 0.05), 20);
        for (c = 0; c < 3; c++) {
            H[9 * (3 * i + c) + 3 * i + c] += cot, H[9 * (3 * j + c) + 3 * j + c] += cot;
            H[9 * (3 * i + c) + 3 * j + c] -= cot, H[9 * (3 * j + c) + 3 * i + c] -= cot;
        }
    }
}

/* The kit's matrices fail without a sentence. */
static cloth_status kdsmi_told(const cloth_hooks *hooks, cloth_status status) {
    return status ? kdsmi_fail(hooks, status, "the cloth's Laplacian: %s",
                               cloth_status_text(status)) : CLOTH_OK;
}

static cloth_status kdsmi_cloth_matrix(kdsmi_cloth *c, const cloth_hooks *hooks) {
    const int    nf = c->pub.nf;
    double       H[81];
    int         *start = (int *)kdsmi_alloc(hooks, (size_t)nf + 1, sizeof(int)), f;
    cloth_status status;
    if (!start) return kdsmi_no_memory(hooks, "cloth");
    for (f = 0; f <= nf; f++) start[f] = 3 * f;
    status = cloth_pattern_create(hooks, c->pub.nv, nf, start, c->pub.faces, NULL, &c->pattern);
    if (!status) status = cloth_matrix_create(hooks, c->pattern, &c->laplace);
    if (!status) status = cloth_factor_create(hooks, c->pattern, &c->factor);
    for (f = 0; f < nf && !status; f++) {
        kdsmi_laplace(c->pub.u, c->pub.faces + 3 * (size_t)f, H);
        status = cloth_matrix_add_element(c->laplace, 3, c->pub.faces + 3 * (size_t)f, H);
    }
    kdsmi_free(hooks, start);
    return kdsmi_told(hooks, status);
}

KDSM_API cloth_status kdsm_cloth_create(const kdsm_space *space, int nv, const double *u, int nf,
                                        const int *faces, kdsm_cloth **out) {
    const cloth_hooks *hooks;
    kdsmi_cloth       *c;
    cloth_status       status;
    int                i;
    if (out) *out = NULL;
    if (!space || !out) return CLOTH_ERR_ARGUMENT;
    hooks = &kdsmi_of(space)->hooks;
    if (nv < 1 || nf < 1 || nv > CLOTH_MAX_COUNT || nf > CLOTH_MAX_COUNT || !faces)
        return kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "a cloth of nv = %d, nf = %d%s", nv, nf,
                          faces ? "" : ", faces NULL");
    status = kdsmi_check(hooks, "u", u, 3 * (size_t)nv);
    for (i = 0; i < 3 * nf && !status; i++)
        if (faces[i] < 0 || faces[i] >= nv)
            status = kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "faces[%d] = %d but nv = %d", i,
                                faces[i], nv);
    if (status) return status;
    c = (kdsmi_cloth *)kdsmi_alloc(hooks, 1, sizeof *c);
    if (!c) return kdsmi_no_memory(hooks, "cloth");
    c->pub.space = space, c->pub.nv = nv, c->pub.nf = nf;
    c->pub.u = (double *)kdsmi_copy(hooks, u, 3 * (size_t)nv, sizeof(double));
    c->pub.faces = (int *)kdsmi_copy(hooks, faces, 3 * (size_t)nf, sizeof(int));
    c->pub.tet = (int *)kdsmi_alloc(hooks, (size_t)nv, sizeof(int));
    c->pub.w = (double *)kdsmi_alloc(hooks, 4 * (size_t)nv, sizeof(double));
    if (!c->pub.u || !c->pub.faces || !c->pub.tet || !c->pub.w)
        status = kdsmi_no_memory(hooks, "cloth");
    if (!status)
        status = kdsm_embed(space, nv, u, c->pub.tet, c->pub.w, &c->pub.outside,
                            &c->pub.farthest);
    if (!status) status = kdsmi_cloth_matrix(c, hooks);
    if (status) kdsm_cloth_destroy(&c->pub);
    else *out = &c->pub;
    return status;
}

KDSM_API void kdsm_cloth_destroy(kdsm_cloth *cloth) {
    kdsmi_cloth       *c = (kdsmi_cloth *)(void *)cloth;
    const cloth_hooks *hooks;
    if (!c) return;
    hooks = &kdsmi_of(cloth->space)->hooks;
    cloth_factor_destroy(c->factor);
    if (c->laplace) cloth_matrix_destroy(c->laplace);
    if (c->pattern) cloth_pattern_destroy(c->pattern);
    kdsmi_free(hooks, cloth->u), kdsmi_free(hooks, cloth->faces);
    kdsmi_free(hooks, cloth->tet), kdsmi_free(hooks, cloth->w);
    kdsmi_free(hooks, c);
}

KDSM_API cloth_status kdsm_place(const kdsm_cloth *cloth, const double *T, const double *d,
                                 double *x, kdsm_place_report *report) {
    const kdsm_space  *s;
    const cloth_hooks *hooks;
    kdsm_place_report  rep;
    cloth_status       status = CLOTH_OK;
    double            *work;
    int               *list, i;
    memset(&rep, 0, sizeof rep);
    if (report) *report = rep;
    if (!cloth || !x) return CLOTH_ERR_ARGUMENT;
    s = cloth->space, hooks = &kdsmi_of(s)->hooks;
    if (d) status = kdsmi_check(hooks, "d", d, 3 * (size_t)cloth->nv);
    if (status) return status;
    /* um, its weights, the space; its tetrahedra, the vertices needed */
    work = (double *)kdsmi_alloc(hooks, 7 * (size_t)cloth->nv + 3 * (size_t)s->nv, sizeof(double));
    list = (int *)kdsmi_alloc(hooks, (size_t)cloth->nv + (size_t)s->nv, sizeof(int));
    if (!work || !list) status = kdsmi_no_memory(hooks, "placing");
    if (!status) {
        double *w = work + 3 * (size_t)cloth->nv, *xv = w + 4 * (size_t)cloth->nv;
        for (i = 0; i < 3 * cloth->nv; i++) work[i] = cloth->u[i] + (d ? d[i] : 0);
        status = kdsm_embed(s, cloth->nv, work, list, w, &rep.outside, &rep.farthest);
        if (!status) status = kdsm_needed(s, cloth->nv, list, list + cloth->nv, &rep.skinned);
        if (!status) status = kdsm_skin(s, T, rep.skinned, list + cloth->nv, xv);
        if (!status) status = kdsm_evaluate(s, xv, cloth->nv, list, w, x, NULL);
    }
    kdsmi_free(hooks, work), kdsmi_free(hooks, list);
    if (report && !status) *report = rep;
    return status;
}

KDSM_API kdsm_options kdsm_options_default(void) {
    kdsm_options o;
    memset(&o, 0, sizeof o);
    o.cookie = KDSMI_COOKIE;
    o.method = KDSM_HYBRID;
    o.accept = 0.01;
    return o;
}

typedef struct kdsmi_work {                 /* of one call, a block of each kind               */
    kdsmi_cloth          *cloth;
    kdsmi_pose           *pose;
    const double         *x;
    kdsm_options          o;
    kdsm_displace_report *rep;
    double               *um, *um2, *e, *b, *w;
    int                  *origin, *tet;
    unsigned char        *fixed, *held;     /* bits for the solver; 1: x is inside of its choice */
} kdsmi_work;

/* Where tetrahedron and weights of a candidate are at rest. */
static void kdsmi_at_rest(const kdsm_space *s, const kdsm_candidate *c, double *um) {
    int k, a;
    for (a = 0; a < 3; a++)
        for (um[a] = 0, k = 0; k < 4; k++)
            um[a] += c->w[k] * s->v[3 * (size_t)s->tet[4 * (size_t)c->tet + (size_t)k] + (size_t)a];
}

/* Method 2 for one point: to what is at rest. */
static void kdsmi_by_surface(const kdsmi_pose *p, const double *x, double *um) {
    const kdsmi_space *s = kdsmi_of(p->pub.space);
    kdsmi_over(p, s->bx, s->bn, x, um);
}

/* A draw of [0, n) that depends on seed and vertex alone (splitmix64). */
static int kdsmi_draw(uint64_t seed, int vertex, int n) {
    uint64_t z = seed + ((uint64_t)vertex + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (int)(z % (uint64_t)n);
}

/* The candidates of vertex i that may be taken are the first *n of the list returned. */
static cloth_status kdsmi_choices(kdsmi_work *k, int i, const kdsm_candidate **list, int *n) {
    int                all;
    const cloth_status status = kdsmi_find(k->pose, k->x + 3 * (size_t)i, &all);
    *list = (const kdsm_candidate *)k->pose->found.at;
    *n = (int)k->pose->found.n;
    if (*n > 0 && (*list)[0].depth >= 0)
        while ((*list)[*n - 1].depth < 0) --*n;
    return status;
}

static void kdsmi_choose(kdsmi_work *k, int i, const kdsm_candidate *c, kdsm_origin origin) {
    kdsmi_at_rest(k->cloth->pub.space, c, k->um + 3 * (size_t)i);
    k->origin[i] = (int)origin;
    k->held[i] = c->depth >= 0;
}

/* The candidate whose place at rest is nearest to `to`, of those within accept; NULL: none is. */
static const kdsm_candidate *kdsmi_next_to(const kdsmi_work *k, const kdsm_candidate *list, int n,
                                           const double *to) {
    const kdsm_candidate *best = NULL;
    double                um[3], least = k->o.accept * k->o.accept;
    int                   i;
    for (i = 0; i < n; i++) {
        double d2;
        kdsmi_at_rest(k->cloth->pub.space, list + i, um);
        d2 = kdsmi_distance2(um, to);
        if (d2 <= least && (!best || d2 < least)) least = d2, best = list + i;
    }
    return best;
}

/* The first look at every vertex, whatever the method. */
static cloth_status kdsmi_first_look(kdsmi_work *k) {
    const int method = (int)k->o.method;
    int       i, n;
    for (i = 0; i < k->cloth->pub.nv; i++) {
        const kdsm_candidate *list, *c;
        const cloth_status    status = kdsmi_choices(k, i, &list, &n);
        double               *um2 = k->um2 + 3 * (size_t)i;
        if (status) return status;
        if (n == 0) k->rep->none++;
        else if (n == 1) k->rep->one++;
        else k->rep->several++;
        k->rep->epsilon += n > 0 && list[0].depth < 0;
        if (method != KDSM_RANDOM || n == 0) kdsmi_by_surface(k->pose, k->x + 3 * (size_t)i, um2);
        if (method == KDSM_SURFACE || (method == KDSM_RANDOM && n == 0)) {
            memcpy(k->um + 3 * (size_t)i, um2, 3 * sizeof(double));
            k->origin[i] = KDSM_FROM_SURFACE;
        } else if (n == 1) kdsmi_choose(k, i, list, KDSM_FROM_ONE);
        else if (method == KDSM_RANDOM)
            kdsmi_choose(k, i, list + kdsmi_draw(k->o.seed, i, n), KDSM_FROM_CHOICE);
        else if ((c = kdsmi_next_to(k, list, n, um2)) != NULL)
            kdsmi_choose(k, i, c, KDSM_FROM_CHOICE);
    }
    return CLOTH_OK;
}

/* e at the vertices without an origin from e at the others; returns how many there are, or -1. */
static cloth_status kdsmi_morph(kdsmi_work *k) {
    const int    nv = k->cloth->pub.nv;
    cloth_status status;
    int          i;
    for (i = 0; i < 3 * nv; i++)
        k->e[i] = k->origin[i / 3] ? k->um[i] - k->um2[i] : 0;
    for (i = 0; i < nv; i++) k->fixed[i] = k->origin[i] ? 7 : 0;
    cloth_matrix_mul(k->cloth->laplace, NULL, k->e, k->b);
    for (i = 0; i < 3 * nv; i++) k->b[i] = k->fixed[i / 3] ? 0 : -k->b[i];
    status = cloth_factor_compute(k->cloth->factor, k->cloth->laplace, k->fixed, 1e-9, NULL);
    if (!status) status = cloth_factor_solve(k->cloth->factor, k->b, k->b);
    for (i = 0; i < 3 * nv && !status; i++)
        if (!k->fixed[i / 3]) k->e[i] = k->b[i];
    return kdsmi_told(&kdsmi_of(k->cloth->pub.space)->hooks, status);
}

/* The rounds of the hybrid. */
static cloth_status kdsmi_rounds(kdsmi_work *k) {
    const double accept2 = k->o.accept * k->o.accept;
    int          left = 0, added = 1, i, a, n;
    for (i = 0; i < k->cloth->pub.nv; i++) left += !k->origin[i];
    while (left > 0 && added > 0) {
        cloth_status status = kdsmi_morph(k);
        for (added = 0, i = 0; i < k->cloth->pub.nv && !status; i++) {
            const kdsm_candidate *list, *c;
            double               *e = k->e + 3 * (size_t)i, to[3];
            if (k->origin[i] || !(kdsmi_dot(e, e) < accept2)) continue;
            for (a = 0; a < 3; a++) to[a] = k->um2[3 * (size_t)i + (size_t)a] + e[a];
            status = kdsmi_choices(k, i, &list, &n);
            if (!status && (c = kdsmi_next_to(k, list, n, to)) != NULL)
                kdsmi_choose(k, i, c, KDSM_FROM_MORPH), added++;
        }
        if (status) return status;
        left -= added, k->rep->rounds++;
    }
    for (i = 0; i < k->cloth->pub.nv; i++) {
        if (k->origin[i]) continue;         /* e is of the last round, which added none */
        k->origin[i] = KDSM_FROM_REST;
        for (a = 0; a < 3; a++)
            k->um[3 * (size_t)i + (size_t)a] = k->um2[3 * (size_t)i + (size_t)a]
                                               + k->e[3 * (size_t)i + (size_t)a];
    }
    return CLOTH_OK;
}

/* What um gives back in the pose, and the sizes of error and displacement. */
static cloth_status kdsmi_judge(kdsmi_work *k, double *d, int *origin) {
    const kdsm_cloth     *c = &k->cloth->pub;
    kdsm_displace_report *r = k->rep;
    cloth_status          status;
    int                   i, a;
    status = kdsm_embed(c->space, c->nv, k->um, k->tet, k->w, &r->outside, NULL);
    if (!status)
        status = kdsm_evaluate(c->space, k->pose->pub.x, c->nv, k->tet, k->w, k->b, NULL);
    for (i = 0; i < c->nv && !status; i++) {
        const size_t at = 3 * (size_t)i;
        const double error = sqrt(kdsmi_distance2(k->b + at, k->x + at));
        const double size = sqrt(kdsmi_distance2(k->um + at, c->u + at));
        r->error_max = fmax(r->error_max, error), r->error_mean += error / c->nv;
        r->d_max = fmax(r->d_max, size), r->d_mean += size / c->nv;
        if (k->held[i]) r->held_max = fmax(r->held_max, error);
        r->origin[k->origin[i]]++;
        if (origin) origin[i] = k->origin[i];
        for (a = 0; a < 3; a++) d[at + (size_t)a] = k->um[at + (size_t)a] - c->u[at + (size_t)a];
    }
    return status;
}

static cloth_status kdsmi_check_displace(const kdsm_cloth *cloth, const kdsm_pose *pose,
                                         const double *x, const kdsm_options *o) {
    const cloth_hooks *hooks = &kdsmi_of(cloth->space)->hooks;
    if (pose->space != cloth->space)
        return kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "the pose is of another space than the cloth");
    if (o->cookie != KDSMI_COOKIE) return CLOTH_ERR_UNINIT;
    if (!kdsmi_finite(o->accept))
        return kdsmi_fail(hooks, CLOTH_ERR_NONFINITE, "options.accept = %g", o->accept);
    if (!(o->accept > 0) || o->method < KDSM_RANDOM || o->method > KDSM_HYBRID)
        return kdsmi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.accept = %g, method = %d", o->accept,
                          (int)o->method);
    return kdsmi_check(hooks, "x", x, 3 * (size_t)cloth->nv);
}

KDSM_API cloth_status kdsm_displace(kdsm_cloth *cloth, kdsm_pose *pose, const double *x,
                                    const kdsm_options *options, double *d, int *origin,
                                    kdsm_displace_report *report) {
    kdsm_displace_report rep;
    const cloth_hooks   *hooks;
    kdsmi_work           k;
    cloth_status         status;
    size_t               n;
    memset(&rep, 0, sizeof rep), memset(&k, 0, sizeof k);
    if (report) *report = rep;
    if (!cloth || !pose || !d) return CLOTH_ERR_ARGUMENT;
    k.o = options ? *options : kdsm_options_default();
    status = kdsmi_check_displace(cloth, pose, x, &k.o);
    if (status) return status;
    hooks = &kdsmi_of(cloth->space)->hooks, n = (size_t)cloth->nv;
    k.cloth = (kdsmi_cloth *)(void *)cloth, k.pose = (kdsmi_pose *)(void *)pose;
    k.x = x, k.rep = &rep;
    k.um = (double *)kdsmi_alloc(hooks, n, 16 * sizeof(double));
    k.origin = (int *)kdsmi_alloc(hooks, n, 2 * sizeof(int));
    k.fixed = (unsigned char *)kdsmi_alloc(hooks, n, 2);
    if (!k.um || !k.origin || !k.fixed) status = kdsmi_no_memory(hooks, "displacements");
    if (!status) {
        k.um2 = k.um + 3 * n, k.e = k.um2 + 3 * n, k.b = k.e + 3 * n, k.w = k.b + 3 * n;
        k.tet = k.origin + n, k.held = k.fixed + n;
        status = kdsmi_first_look(&k);
    }
    if (!status && k.o.method == KDSM_HYBRID) status = kdsmi_rounds(&k);
    if (!status) status = kdsmi_judge(&k, d, origin);
    kdsmi_free(hooks, k.um), kdsmi_free(hooks, k.origin), kdsmi_free(hooks, k.fixed);
    if (report && !status) *report = rep;
    return status;
}

#ifdef __cplusplus
}
#endif
#endif /* KDSM_IMPLEMENTATION */
