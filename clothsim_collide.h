/* clothsim_collide.h - what cloth may not pass through.                       version 0.1.0
 * SPDX-License-Identifier: MIT
 *
 * Collisions for clothsim.h: continuous detection, impact zones solved by a quadratic program,
 * a proximity potential and friction inside the implicit step. C99, libc and libm only.
 *
 * In ONE .c file:        #define CLOTHSIM_IMPLEMENTATION
 *                        #include "clothsim_collide.h"
 * everywhere else:       #include "clothsim_collide.h"         (it includes clothsim.h)
 *
 * CONTENTS
 *   the interface
 *     [2.1] CONTINUOUS DETECTION             [2.2] QUADRATIC PROGRAM
 *     [2.3] INTERSECTIONS                    [2.4] DISTANCE GRID
 *     [2.5] CONTACT
 *   the implementation, bottom-up
 *     [3.1] EXACT SIGNS                      [3.2] DISTANCES
 *     [4.1] CONTINUOUS DETECTION
 *     [5.1] HIERARCHY                        [5.2] TRIANGLES THAT INTERSECT
 *     [6.1] QUADRATIC PROGRAM
 *     [7.1] DISTANCE GRID                    [7.2] OBSTACLES THAT PENETRATE THEMSELVES
 *     [8.1] SCENE                            [8.2] PROXIMITY AND FRICTION
 *     [8.3] IMPACT ZONES                     [8.4] THE CONTACT IN THE STEP
 *     [8.5] QUERIES                          [9.1] CHANGES
 */

#ifndef CLOTHSIM_COLLIDE_H
#define CLOTHSIM_COLLIDE_H

#include "clothsim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.1] CONTINUOUS DETECTION ============================================================ */

/* ===== [2.2] QUADRATIC PROGRAM =============================================================== */

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* ===== [2.4] DISTANCE GRID ===================================================================
 *
 * Signed distance to a closed mesh, sampled on a regular grid, for queries and for soft contact:
 * no promise of section [2.5] rests on it.                                    section [7.1] */

#define CLOTH_DEFAULT_GRID_BAND      4                      /* cells                           */
#define CLOTH_DEFAULT_GRID_MAX_NODES ((size_t)1 << 26)      /* half a gigabyte                 */

/* cloth_grid_desc_default() sets every field; nv, x, nf, faces and cell are yours to set. */
typedef struct cloth_grid_desc {
    uint32_t      cookie;       /* set by cloth_grid_desc_default()                            */
    cloth_hooks   hooks;        /* copied                                                      */
    int           nv;           /* vertices                                                    */
    const double *x;            /* [nv x 3] m                                                  */
    int           nf;           /* faces, at least 4                                           */
    const int    *faces;        /* [nf x 3] counter-clockwise seen from outside                */
    double        cell;         /* m, > 0: the distance between nodes                          */
    double        band;         /* m, at least 2 cells: where distances are exact. 0: 4 cells  */
    double        margin;       /* m, at least 1 cell: air around the mesh. 0: the band        */
    size_t        max_nodes;    /* more are refused; 8 bytes each. 0: 2^26                     */
} cloth_grid_desc;

/* Plain arrays, one block. Node (i, j, k) is at origin + cell (i, j, k) and holds
 * phi[(k n[1] + j) n[0] + i], negative inside. A grid filled in by hand may be sampled too. */
typedef struct cloth_grid {
    int     n[3];               /* nodes along x, y and z, at least 2                          */
    double  origin[3];          /* m, node (0, 0, 0)                                           */
    double  cell;               /* m                                                           */
    double  band;               /* m; |phi| = band there and beyond                            */
    double *phi;                /* [n[2] x n[1] x n[0]] m                                      */
} cloth_grid;

CLOTH_API cloth_grid_desc cloth_grid_desc_default(void);

/* The grid of a mesh. Inside is where the winding number is 1 or more: where parts of the mesh
 * overlap, their union is meant.                                                       [7.1]
 * in   desc   the mesh must be closed: as many faces run along every edge one way as the other.
 *             It may have several components, cut through itself and touch itself.
 * out  *out   owned: cloth_grid_destroy; NULL on failure
 *   phi is the distance to the boundary of the union, to rounding, where that is below the band,
 *   else the band; its sign is right everywhere, but for nodes within rounding of the mesh.
 *   A face that is cut by another counts whole: inside an overlap, near its border, phi may be
 *   the distance to the hidden part of such a face.
 * returns CLOTH_OK; CLOTH_ERR_UNINIT; CLOTH_ERR_ARGUMENT: a NULL, a size out of range;
 *   CLOTH_ERR_NONFINITE: a coordinate, cell, band or margin; CLOTH_ERR_MESH: an index out of
 *   range, an edge where the mesh is open or badly oriented (the sentence names it), the volume
 *   not positive; CLOTH_ERR_CAPACITY: more than max_nodes; CLOTH_ERR_MEMORY. Logged.
 * contract: alloc one block and scratch (500 bytes a face) | cost: signs O(nf + area in cells),
 *   then a nearest-face query, ~2 us, per node of the band and per 64 nodes elsewhere |
 *   hooks.parallel, the same bits for any workers */
CLOTH_API cloth_status cloth_grid_create(const cloth_grid_desc *desc, cloth_grid **out);
CLOTH_API void cloth_grid_destroy(cloth_grid *grid);

/* Held from the allocator: 8 bytes a node and about 250. 0 for NULL. */
CLOTH_API size_t cloth_grid_bytes(const cloth_grid *grid);

/* phi at x (m) by trilinear interpolation, and the gradient of the interpolant (on the border of
 * two cells that of the upper one). Outside the grid sqrt(|x - q|^2 + phi(q)^2), q the nearest
 * point of the grid: continuous, and never above the distance that |x - q| and phi(q) allow.
 * in   grid   from cloth_grid_create, or filled in by hand
 * out  distance, gradient [3]; either may be NULL; untouched unless CLOTH_OK
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: NULL; CLOTH_ERR_NONFINITE: x
 * contract: alloc none | cost O(1), 8 loads | threads: any */
CLOTH_API cloth_status cloth_grid_sample(const cloth_grid *grid, const double x[3],
                                         double *distance, double gradient[3]);

/* ===== [2.5] CONTACT ========================================================================= */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_COLLIDE_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_COLLIDE_IMPLEMENTED)
#define CLOTHSIM_COLLIDE_IMPLEMENTED

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] EXACT SIGNS =====================================================================
 *
 * The sign of a determinant of coordinates, exact. A floating evaluation with an error bound
 * answers nearly always; the rest is worked out without rounding. [Shewchuk 1997, Adaptive
 * precision floating-point arithmetic and fast robust geometric predicates, Discrete &
 * Computational Geometry 18, theorems 6, 7, 10, 18; doi 10.1007/PL00009321]
 *
 *     a + b  =  s + r     s the rounded sum, r what rounding lost, both doubles (two_sum)
 *     a * b  =  p + r     likewise, from halves of 26 bits of a and b (Dekker's product)
 *
 * An expansion is a sum of doubles whose bits do not overlap, smallest first: its sign is that of
 * the last one. Sums and products of expansions are built by adding one double after the other,
 * which is quadratic in the length and never long here.
 *
 * Range: exact for coordinates that are 0 or have 1e-85 < |x| < 1e85. Below, products underflow.
 * Halves are cut by the bits of the number, so contraction to fused multiply-adds cannot change
 * them.
 *
 * checked: tests/test_exact.c */

CLOTHI_UNUSED static void clothi_two_sum(double a, double b, double *s, double *r) {
    const double sum = a + b, bv = sum - a, av = sum - bv;
    *s = sum;
    *r = (a - av) + (b - bv);
}

/* a = hi + the rest, both of at most 26 bits. */
CLOTHI_UNUSED static double clothi_high_half(double a) {
    uint64_t bits;
    memcpy(&bits, &a, sizeof bits);
    bits = (bits + 0x4000000u) & ~(uint64_t)0x7ffffffu;
    memcpy(&a, &bits, sizeof a);
    return a;
}

/* Out of line: where it is inlined a compiler may fuse p into the caller's next sum. */
CLOTHI_OUTLINE static void clothi_two_product(double a, double b, double *p, double *r) {
    const double ah = clothi_high_half(a), al = a - ah, bh = clothi_high_half(b), bl = b - bh;
    *p = a * b;
    *r = al * bl - (((*p - ah * bh) - al * bh) - ah * bl);
}

/* e [n] += b; returns the new length, at most n + 1. Zeros are left out; 0 has length 1 or 0. */
CLOTHI_UNUSED static int clothi_exp_grow(double *e, int n, double b) {
    double q = b, r;
    int    i, m = 0;
    for (i = 0; i < n; i++) {
        clothi_two_sum(q, e[i], &q, &r);
        if (r != 0) e[m++] = r;
    }
    if (q != 0 || m == 0) e[m++] = q;
    return m;
}

/* out [na + nb] = a + sign b, out not a or b. */
CLOTHI_UNUSED static int clothi_exp_sum(const double *a, int na, const double *b, int nb,
                                        double sign, double *out) {
    int i, n = na;
    for (i = 0; i < na; i++) out[i] = a[i];
    for (i = 0; i < nb; i++) n = clothi_exp_grow(out, n, sign * b[i]);
    return n;
}

/* out [2 na] = a s. */
CLOTHI_UNUSED static int clothi_exp_scale(const double *a, int na, double s, double *out) {
    int i, n = 0;
    for (i = 0; i < na; i++) {
        double p, r;
        clothi_two_product(a[i], s, &p, &r);
        n = clothi_exp_grow(out, n, r);
        n = clothi_exp_grow(out, n, p);
    }
    return n;
}

/* out [2 na nb] = a b. */
CLOTHI_UNUSED static int clothi_exp_product(const double *a, int na, const double *b, int nb,
                                            double *out) {
    int i, k, n = 0;
    for (i = 0; i < na; i++)
        for (k = 0; k < nb; k++) {
            double p, r;
            clothi_two_product(a[i], b[k], &p, &r);
            n = clothi_exp_grow(out, n, r);
            n = clothi_exp_grow(out, n, p);
        }
    return n;
}

CLOTHI_UNUSED static int clothi_exp_sign(const double *e, int n) {
    const double top = n > 0 ? e[n - 1] : 0;
    return (top > 0) - (top < 0);
}

/* out [2] = a - b. */
CLOTHI_UNUSED static void clothi_exp_difference(double a, double b, double *out) {
    clothi_two_sum(a, -b, out + 1, out);
}

/* out [16] = a d - b c, each of two doubles; returns the length. */
CLOTHI_UNUSED static int clothi_exp_minor(const double *a, const double *b, const double *c,
                                          const double *d, double *out) {
    double    p[8], q[8];
    const int np = clothi_exp_product(a, 2, d, 2, p), nq = clothi_exp_product(b, 2, c, 2, q);
    return clothi_exp_sum(p, np, q, nq, -1, out);
}

/* Sign of (a-c) x (b-c): 1 when a, b, c [2] turn counter-clockwise, 0 on one line. */
CLOTHI_UNUSED static int clothi_orient2d(const double *a, const double *b, const double *c) {
    const double p = (a[0] - c[0]) * (b[1] - c[1]), q = (a[1] - c[1]) * (b[0] - c[0]);
    const double det = p - q, bound = 4.5e-16 * (fabs(p) + fabs(q));  /* 3 roundings of 2^-53 */
    double       u[2][2], v[2][2], e[16];
    int          i;
    if (det > bound || -det > bound) return det > 0 ? 1 : -1;
    for (i = 0; i < 2; i++) {
        clothi_exp_difference(a[i], c[i], u[i]);
        clothi_exp_difference(b[i], c[i], v[i]);
    }
    return clothi_exp_sign(e, clothi_exp_minor(u[0], u[1], v[0], v[1], e));
}

/* Sign of (a-d) . (b-d) x (c-d): 1 when a, b, c turn counter-clockwise seen from the side that d
 * is not on, 0 in one plane. */
CLOTHI_UNUSED static int clothi_orient3d(const double *a, const double *b, const double *c,
                                         const double *d) {
    const double *x[3];
    double        w[3][3], e[3][3][2], m[16], part[64], sum[192], old[192], det = 0, bound = 0;
    int           i, k, n = 0;
    x[0] = a;
    x[1] = b;
    x[2] = c;
    for (i = 0; i < 3; i++) clothi_sub3(x[i], d, w[i]);
    for (i = 0; i < 3; i++) {
        const int    j = (i + 1) % 3, l = (i + 2) % 3;
        const double p = w[1][j] * w[2][l], q = w[1][l] * w[2][j];
        det += w[0][i] * (p - q);
        bound += fabs(w[0][i]) * (fabs(p) + fabs(q));
    }
    bound *= 1.2e-15;                       /* at most 9 roundings of 2^-53 in each product     */
    if (det > bound || -det > bound) return det > 0 ? 1 : -1;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) clothi_exp_difference(x[i][k], d[k], e[i][k]);
    for (i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        const int nm = clothi_exp_minor(e[1][j], e[1][l], e[2][j], e[2][l], m);
        const int np = clothi_exp_product(m, nm, e[0][i], 2, part);
        memcpy(old, sum, sizeof(double) * (size_t)n);
        n = clothi_exp_sum(old, n, part, np, 1, sum);
    }
    return clothi_exp_sign(sum, n);
}

/* ===== [3.2] DISTANCES ======================================================================= */

/* ===== [4.1] CONTINUOUS DETECTION ============================================================ */

/* ===== [5.1] HIERARCHY ========================================================================
 *
 *            1                 Boxes around boxes, as a complete binary tree in one array: the
 *         /     \              children of node i are 2i and 2i+1, its depth d is chosen so that
 *        2       3             the 2^d leaves hold at most CLOTHI_BVH_LEAF items each. With the
 *       / \     / \            items in leaf order, node j of level l holds the items
 *      4   5   6   7               [ floor(j n / 2^l), floor((j+1) n / 2^l) ):
 *     ...             items    no pointers, no counts, no recursion. n items, d < 29.
 *
 *   build     Each node is split at its median along the axis on which the centres of its boxes
 *             reach furthest. The items are sorted once along each axis; a split keeps the three
 *             orders by stable partition: O(n log n), whatever the boxes are.
 *   refit     Bottom-up in one sweep over the array; the splits stay. A mesh that deforms keeps
 *             its neighbours, so that the tree stays good.
 *   rounding  Nodes are floats rounded outward: r = fl(x) - d with d >= ulp(fl(x)) is, rounding
 *             being monotone, at most fl(x) - ulp < x. They only prune; an item pair is decided by
 *             the given doubles, touching counts as overlapping: the answer is that of brute
 *             force. NaN is unbounded: it overlaps everything.
 *   descent   Of two overlapping nodes the larger one is opened (the sum of a box's extents is kept
 *             in its fourth lane). A stack of pairs: opening one puts two on it and goes one level
 *             down, so at most (levels of A) + (levels of B) + 1 <= 57 wait; the self query opens
 *             (a, a) into three and goes two levels down: the same bound.
 *   order     The pairs of nodes at a fixed level are the tasks of a parallel loop. Each writes
 *             into its own segment of the list, sized by what it found last time; a task that
 *             needs more counts on, and when all are done the segments are laid out anew and the
 *             loop runs again. Hence no allocation beside the loop or in the steady state, and
 *             one order of pairs for any number of workers.
 *   features  A vertex belongs to many faces, and its collision with a face would be found once
 *             for each. One face owns each vertex and each edge, and only the owner reports it
 *             [CTM08]. Nothing is lost: a box around the owner is around what it owns.
 *
 * [CTM08] Curtis, Tamstorf, Manocha: Fast collision detection for deformable models using
 *         representative-triangles, I3D 2008.
 * checked: tests/test_tree.c */

#define CLOTHI_BVH_LEAF   4
#define CLOTHI_BVH_STACK  64
#define CLOTHI_BVH_TASKS  4                 /* level whose nodes are the tasks, pairwise       */

typedef struct clothi_box {
    float lo[4], hi[4];                     /* x y z; lo[3]: sum of the extents, hi[3]: 0      */
} clothi_box;

/* A tree over n boxes. memset to 0 before the first build. Item i is reported as first + i. */
typedef struct clothi_bvh {
    int         n, depth;
    int         first;                      /* 0 after build; the caller's to set              */
    int        *item;                       /* [n] items in leaf order                         */
    double     *exact;                      /* [n x 6] their boxes                             */
    clothi_box *bound;                      /* [n] the same, rounded outward                   */
    clothi_box *node;                       /* [2^(depth+1)] from 1                            */
} clothi_bvh;

/* A growing list of pairs. memset to 0 before the first use; the memory is kept from one query to
 * the next, so that its size is a high-water mark. */
typedef struct clothi_pairs {
    int     count;
    int    *pair;                           /* [count x 2]                                     */
    size_t  room;                           /* pairs that the memory holds                     */
    int     tasks;                          /* entries of the arrays below                     */
    size_t *start;                          /* [tasks + 1] segment of each task                */
    size_t *found;                          /* [tasks] pairs that it has, also beyond its room */
    int     grown;                          /* times that memory was asked for                 */
} clothi_pairs;

/* --- the list of pairs --- */

CLOTHI_UNUSED static void clothi_pairs_free(const cloth_hooks *hooks, clothi_pairs *p) {
    clothi_free(hooks, p->pair);
    clothi_free(hooks, p->start);
    memset(p, 0, sizeof *p);
}

/* Where a task writes. */
typedef struct clothi_segment {
    int   *pair;
    size_t room, found;
} clothi_segment;

static clothi_segment clothi_segment_open(const clothi_pairs *p, int task) {
    clothi_segment s;
    s.pair = p->pair + 2 * p->start[task];
    s.room = p->start[task + 1] - p->start[task];
    s.found = 0;
    return s;
}

static inline void clothi_segment_put(clothi_segment *s, int a, int b) {
    if (s->found < s->room) {
        s->pair[2 * s->found] = a;
        s->pair[2 * s->found + 1] = b;
    }
    s->found++;
}

/* Segments for more tasks; new ones get room for `least` pairs. */
static cloth_status clothi_pairs_tasks(const cloth_hooks *hooks, clothi_pairs *p, int tasks,
                                       size_t least) {
    const size_t n = (size_t)tasks + (size_t)tasks / 2u;
    size_t      *start, i;
    if (tasks <= p->tasks) return CLOTH_OK;
    start = (size_t *)clothi_alloc(hooks, 2 * n + 1u, sizeof *start);
    if (!start) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %i tasks", tasks);
    p->grown++;
    for (i = 0; i < n; i++)
        start[i + 1] = start[i] + (i < (size_t)p->tasks ? p->start[i + 1] - p->start[i] : least);
    clothi_free(hooks, p->start);
    p->start = start;
    p->found = start + n + 1u;
    p->tasks = (int)n;
    return CLOTH_OK;
}

/* Memory for all segments, what they hold is lost. */
static cloth_status clothi_pairs_lay(const cloth_hooks *hooks, clothi_pairs *p) {
    const size_t need = p->start[p->tasks];
    int         *pair;
    if (need <= p->room) return CLOTH_OK;
    pair = (int *)clothi_alloc(hooks, need, 2 * sizeof *pair);
    if (!pair) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %z pairs", need);
    p->grown++;
    clothi_free(hooks, p->pair);
    p->pair = pair;
    p->room = need;
    return CLOTH_OK;
}

/* 1 when every task had room; else gives room to those that had not. */
static int clothi_pairs_fit(clothi_pairs *p, int tasks) {
    size_t end = p->start[0];
    int    i, fit = 1;
    for (i = 0; i < p->tasks; i++) {
        size_t room = p->start[i + 1] - end;
        if (i < tasks && p->found[i] > room) {
            room = p->found[i] + p->found[i] / 4u + 16u;
            fit = 0;
        }
        end = p->start[i + 1];
        p->start[i + 1] = p->start[i] + room;
    }
    return fit;
}

/* The segments one behind the other. */
static cloth_status clothi_pairs_close(const cloth_hooks *hooks, clothi_pairs *p, int tasks) {
    size_t at = 0;
    int    i;
    for (i = 0; i < tasks; i++) {
        memmove(p->pair + 2 * at, p->pair + 2 * p->start[i], 2 * p->found[i] * sizeof(int));
        at += p->found[i];
    }
    if (at > (size_t)(0x7fffffff / 2))
        return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "%z pairs are too many", at);
    p->count = (int)at;
    return CLOTH_OK;
}

/* Runs fn over `tasks` tasks, which fill the segments of nlists lists, until all have room.
 * least: first guess of a segment's room. On failure every list is empty. */
static cloth_status clothi_pairs_run(const cloth_hooks *hooks, clothi_pairs *const *list,
                                     int nlists, int tasks, size_t least, cloth_range_fn *fn,
                                     void *ctx) {
    cloth_status status = CLOTH_OK;
    int          k, fit = 0;
    for (k = 0; k < nlists; k++) list[k]->count = 0;
    if (tasks == 0) return CLOTH_OK;
    for (k = 0; k < nlists && status == CLOTH_OK; k++)
        status = clothi_pairs_tasks(hooks, list[k], tasks, least);
    while (!fit && status == CLOTH_OK) {
        for (k = 0; k < nlists && status == CLOTH_OK; k++)
            status = clothi_pairs_lay(hooks, list[k]);
        if (status != CLOTH_OK) break;
        clothi_for(hooks, tasks, 1, fn, ctx);
        for (fit = 1, k = 0; k < nlists; k++) fit &= clothi_pairs_fit(list[k], tasks);
    }
    for (k = 0; k < nlists && status == CLOTH_OK; k++)
        status = clothi_pairs_close(hooks, list[k], tasks);
    for (k = 0; k < nlists && status != CLOTH_OK; k++) list[k]->count = 0;
    return status;
}

/* --- boxes --- */

/* The box over x moving linearly from xa to xb, and `pad` on every side: [n x 6] min xyz, max xyz.
 * in   xa, xb  [n x 3] m; xb NULL: at rest
 * in   pad     m, >= 0. Two points come within D of each other only if their boxes with pads that
 *              add up to D overlap */
CLOTHI_UNUSED static void clothi_swept_boxes(int n, const double *xa, const double *xb,
                                             double pad, double *box) {
    int i, k;
    if (!xb) xb = xa;
    pad *= 1 + 1e-15;
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            const double a = xa[3 * i + k], b = xb[3 * i + k];
            double       lo = a < b ? a : b, hi = a < b ? b : a;
            if (pad > 0) {                  /* a unit in the last place covers the rounding    */
                lo -= pad;
                hi += pad;
                lo -= fabs(lo) * 2.3e-16;
                hi += fabs(hi) * 2.3e-16;
            }
            box[6 * i + k] = lo;
            box[6 * i + 3 + k] = hi;
        }
}

static inline void clothi_box_join(const double *a, const double *b, double *out) {
    int k;
    for (k = 0; k < 3; k++) {
        out[k] = a[k] < b[k] ? a[k] : b[k];
        out[3 + k] = a[3 + k] > b[3 + k] ? a[3 + k] : b[3 + k];
    }
}

/* The boxes [nf x 6] of faces from those of their vertices, vertex_box [nv x 6]. */
CLOTHI_UNUSED static void clothi_face_boxes(int nf, const int *faces, const double *vertex_box,
                                            double *box) {
    int f;
    for (f = 0; f < nf; f++) {
        clothi_box_join(vertex_box + 6 * faces[3 * f], vertex_box + 6 * faces[3 * f + 1],
                        box + 6 * f);
        clothi_box_join(box + 6 * f, vertex_box + 6 * faces[3 * f + 2], box + 6 * f);
    }
}

/* [6] against [6], touching included; NaN overlaps. */
static inline int clothi_boxes_meet(const double *a, const double *b) {
    return !((a[0] > b[3]) | (b[0] > a[3]) | (a[1] > b[4]) | (b[1] > a[4]) | (a[2] > b[5]) |
             (b[2] > a[5]));
}

static inline int clothi_nodes_meet(const clothi_box *a, const clothi_box *b) {
#if defined(CLOTHI_AVX) || defined(CLOTHI_SSE2)
    const __m128 below = _mm_cmple_ps(_mm_load_ps(a->lo), _mm_load_ps(b->hi));
    const __m128 above = _mm_cmple_ps(_mm_load_ps(b->lo), _mm_load_ps(a->hi));
    return (_mm_movemask_ps(_mm_and_ps(below, above)) & 7) == 7;
#else
    return (a->lo[0] <= b->hi[0]) & (b->lo[0] <= a->hi[0]) & (a->lo[1] <= b->hi[1]) &
           (b->lo[1] <= a->hi[1]) & (a->lo[2] <= b->hi[2]) & (b->lo[2] <= a->hi[2]);
#endif
}

#define CLOTHI_BVH_FAR  3.4e38              /* within the range of floats                      */
#define CLOTHI_BVH_STEP 1.2e-7f             /* more than 2^-23                                 */
#define CLOTHI_BVH_TINY 1.2e-38f            /* a step below the normal floats                  */

/* Floats that are not above, not below a double. */
static inline float clothi_float_below(double x) {
    float r;
    if (!(x >= -CLOTHI_BVH_FAR)) return -HUGE_VALF;
    r = (float)(x < CLOTHI_BVH_FAR ? x : CLOTHI_BVH_FAR);
    return r - (fabsf(r) * CLOTHI_BVH_STEP + CLOTHI_BVH_TINY);
}

static inline float clothi_float_above(double x) {
    float r;
    if (!(x <= CLOTHI_BVH_FAR)) return HUGE_VALF;
    r = (float)(x > -CLOTHI_BVH_FAR ? x : -CLOTHI_BVH_FAR);
    return r + (fabsf(r) * CLOTHI_BVH_STEP + CLOTHI_BVH_TINY);
}

static void clothi_node_empty(clothi_box *b) {
    int k;
    for (k = 0; k < 4; k++) {
        b->lo[k] = HUGE_VALF;
        b->hi[k] = -HUGE_VALF;
    }
}

static inline void clothi_node_join(const clothi_box *a, const clothi_box *b, clothi_box *out) {
    int k;
    for (k = 0; k < 4; k++) {
        out->lo[k] = a->lo[k] < b->lo[k] ? a->lo[k] : b->lo[k];
        out->hi[k] = a->hi[k] > b->hi[k] ? a->hi[k] : b->hi[k];
    }
}

static inline void clothi_node_measure(clothi_box *b) {
    b->lo[3] = (b->hi[0] - b->lo[0]) + (b->hi[1] - b->lo[1]) + (b->hi[2] - b->lo[2]);
    b->hi[3] = 0;
}

/* --- build and refit --- */

/* First item of node j of a level; of node j + 1: the end of node j. */
static inline int clothi_bvh_item(const clothi_bvh *t, int j, int level) {
    return (int)(((uint64_t)(unsigned)j * (unsigned)t->n) >> level);
}

CLOTHI_UNUSED static void clothi_bvh_free(const cloth_hooks *hooks, clothi_bvh *t) {
    clothi_free(hooks, t->node);
    memset(t, 0, sizeof *t);
}

typedef struct clothi_bvh_job {
    clothi_bvh   *tree;
    const double *box;
    int           level;                    /* of the subtrees                                 */
} clothi_bvh_job;

static void clothi_bvh_refit_leaf(clothi_bvh *t, const double *box, int leaf) {
    const int   end = clothi_bvh_item(t, leaf + 1, t->depth);
    clothi_box *node = t->node + ((size_t)1 << t->depth) + leaf;
    int         i = clothi_bvh_item(t, leaf, t->depth), k;
    clothi_node_empty(node);
    for (; i < end; i++) {
        const double *b = box + 6 * (size_t)t->item[i];
        clothi_box   *r = t->bound + i;
        memcpy(t->exact + 6 * (size_t)i, b, 6 * sizeof *b);
        for (k = 0; k < 3; k++) {
            r->lo[k] = clothi_float_below(b[k]);
            r->hi[k] = clothi_float_above(b[3 + k]);
        }
        clothi_node_join(node, r, node);
    }
    clothi_node_measure(node);
}

/* Whole subtrees: leaves first, then level by level up to their roots. */
static void clothi_bvh_refit_range(int begin, int end, int worker, void *ctx) {
    const clothi_bvh_job *job = (const clothi_bvh_job *)ctx;
    clothi_bvh           *t = job->tree;
    int                   level, j;
    (void)worker;
    for (j = begin << (t->depth - job->level); j < end << (t->depth - job->level); j++)
        clothi_bvh_refit_leaf(t, job->box, j);
    for (level = t->depth - 1; level >= job->level; level--)
        for (j = begin << (level - job->level); j < end << (level - job->level); j++) {
            clothi_box *node = t->node + ((size_t)1 << level) + j;
            const clothi_box *child = t->node + ((size_t)2 << level) + 2 * (size_t)j;
            clothi_node_join(child, child + 1, node);
            clothi_node_measure(node);
        }
}

/* Takes other boxes, box [n x 6], for the same items.
 * contract: alloc none | cost O(n), ~15 ns an item | same bits for any worker count */
CLOTHI_UNUSED static void clothi_bvh_refit(const cloth_hooks *hooks, clothi_bvh *t,
                                           const double *box) {
    clothi_bvh_job job;
    int            i;
    job.tree = t;
    job.box = box;
    job.level = t->depth < CLOTHI_BVH_TASKS ? t->depth : CLOTHI_BVH_TASKS;
    clothi_for(hooks, 1 << job.level, 1, clothi_bvh_refit_range, &job);
    for (i = (1 << job.level) - 1; i > 0; i--) {
        clothi_node_join(t->node + 2 * i, t->node + 2 * i + 1, t->node + i);
        clothi_node_measure(t->node + i);
    }
}

/* One block: nodes, item bounds, item boxes, order. */
static cloth_status clothi_bvh_alloc(const cloth_hooks *hooks, int n, clothi_bvh *t) {
    size_t nodes, size;
    t->n = n;
    while (n > CLOTHI_BVH_LEAF && ((n - 1) >> t->depth) + 1 > CLOTHI_BVH_LEAF) t->depth++;
    nodes = (size_t)2 << t->depth;
    size = nodes * sizeof *t->node +
           (size_t)n * (sizeof *t->bound + 6 * sizeof *t->exact + sizeof *t->item);
    t->node = (clothi_box *)clothi_alloc(hooks, size, 1);
    if (!t->node)
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for a tree of %i boxes", t->n);
    t->bound = t->node + nodes;
    t->exact = (double *)(void *)(t->bound + n);
    t->item = (int *)(void *)(t->exact + 6 * (size_t)n);
    return CLOTH_OK;
}

/* Items [lo, hi) of the three sorted orders, halved at mid along the widest axis. side [n] and
 * tmp [n] are scratch. */
static void clothi_bvh_split(int n, const double *key, int *order, int lo, int mid, int hi,
                             unsigned char *side, int *tmp) {
    double widest = -1;
    int    axis = 0, k, i;
    for (k = 0; k < 3; k++) {
        const int    *o = order + (size_t)k * (size_t)n;
        const double *c = key + (size_t)k * (size_t)n;
        const double  extent = c[o[hi - 1]] - c[o[lo]];
        if (extent > widest) {
            widest = extent;
            axis = k;
        }
    }
    for (i = lo; i < hi; i++) side[order[(size_t)axis * (size_t)n + (size_t)i]] = i >= mid;
    for (k = 0; k < 3; k++) {
        int *o = order + (size_t)k * (size_t)n, left = lo, right = 0;
        if (k == axis) continue;
        for (i = lo; i < hi; i++) {
            if (side[o[i]]) tmp[right++] = o[i];
            else o[left++] = o[i];
        }
        memcpy(o + mid, tmp, (size_t)right * sizeof *tmp);
    }
}

/* A tree over box [n x 6] (min xyz, max xyz), n in [0, CLOTH_MAX_COUNT]; the boxes are copied.
 * out  *t      owned: clothi_bvh_free; empty on failure
 * returns CLOTH_OK, CLOTH_ERR_MEMORY
 * contract: alloc one block of ~110 n bytes and scratch | cost O(n log n) | serial build */
CLOTHI_UNUSED static cloth_status clothi_bvh_build(const cloth_hooks *hooks, int n,
                                                   const double *box, clothi_bvh *t) {
    const size_t   m = (size_t)n;
    cloth_status   status;
    double        *key = NULL;
    int           *order = NULL, *tmp, i, k, level;
    unsigned char *side;
    memset(t, 0, sizeof *t);
    status = clothi_bvh_alloc(hooks, n, t);
    key = (double *)clothi_alloc(hooks, 3 * m, sizeof *key);
    order = (int *)clothi_alloc(hooks, 4 * m * sizeof *order + m, 1);
    if (status != CLOTH_OK || !key || !order) {
        if (status == CLOTH_OK)
            status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to sort %i boxes", n);
        clothi_bvh_free(hooks, t);
        goto done;
    }
    tmp = order + 3 * m;
    side = (unsigned char *)(tmp + m);
    for (k = 0; k < 3; k++) {
        for (i = 0; i < n; i++) {
            const double centre = 0.5 * box[6 * (size_t)i + (size_t)k] +
                                  0.5 * box[6 * (size_t)i + (size_t)k + 3];
            key[(size_t)k * m + (size_t)i] = clothi_finite(centre) ? centre : 0;
            order[(size_t)k * m + (size_t)i] = i;
        }
        clothi_sort(order + (size_t)k * m, tmp, n, key + (size_t)k * m);
    }
    for (level = 0; level < t->depth; level++)
        for (i = 0; i < 1 << level; i++)
            clothi_bvh_split(n, key, order, clothi_bvh_item(t, i, level),
                             clothi_bvh_item(t, 2 * i + 1, level + 1),
                             clothi_bvh_item(t, i + 1, level), side, tmp);
    memcpy(t->item, order, m * sizeof *order);
    clothi_bvh_refit(hooks, t, box);
done:
    clothi_free(hooks, order);
    clothi_free(hooks, key);
    return status;
}

/* --- queries --- */

typedef struct clothi_bvh_query {
    const clothi_bvh *a, *b;                /* b NULL: a against itself                        */
    clothi_pairs     *pairs;
    int               level_a, level_b;     /* of the tasks                                    */
} clothi_bvh_query;

/* Items i of a against the items [j, end) of b. */
static inline void clothi_bvh_row(const clothi_bvh *a, int i, const clothi_bvh *b, int j, int end,
                                  int ordered, clothi_segment *out) {
    const clothi_box *bound = a->bound + i;
    for (; j < end; j++) {
        int p, q;
        if (!clothi_nodes_meet(bound, b->bound + j) ||
            !clothi_boxes_meet(a->exact + 6 * (size_t)i, b->exact + 6 * (size_t)j))
            continue;
        p = a->first + a->item[i];
        q = b->first + b->item[j];
        if (ordered && p > q) clothi_segment_put(out, q, p);
        else clothi_segment_put(out, p, q);
    }
}

/* Leaf na of a against leaf nb of b (node numbers); of the same tree when self. */
static void clothi_bvh_leaves(const clothi_bvh *a, int na, const clothi_bvh *b, int nb, int self,
                              clothi_segment *out) {
    const int la = na - (1 << a->depth), lb = nb - (1 << b->depth);
    const int end_a = clothi_bvh_item(a, la + 1, a->depth);
    const int begin_b = clothi_bvh_item(b, lb, b->depth);
    const int end_b = clothi_bvh_item(b, lb + 1, b->depth);
    const clothi_box *box = b->node + nb;
    int i;
    for (i = clothi_bvh_item(a, la, a->depth); i < end_a; i++) {
        if (self && na == nb) clothi_bvh_row(a, i, b, i + 1, end_b, 1, out);
        else if (clothi_nodes_meet(a->bound + i, box))
            clothi_bvh_row(a, i, b, begin_b, end_b, self, out);
    }
}

/* All item pairs below the nodes na of a and nb of b, which meet. */
static void clothi_bvh_descend(const clothi_bvh *a, int na, const clothi_bvh *b, int nb, int self,
                               clothi_segment *out) {
    const int leaf_a = 1 << a->depth, leaf_b = 1 << b->depth;
    int       stack[CLOTHI_BVH_STACK][2], n = 0;
    for (;;) {
        if (na >= leaf_a && nb >= leaf_b) {
            clothi_bvh_leaves(a, na, b, nb, self, out);
        } else if (self && na == nb) {
            const int left = 2 * na;
            stack[n][0] = stack[n][1] = left;
            n++;
            stack[n][0] = stack[n][1] = left + 1;
            n++;
            stack[n][0] = left;
            stack[n][1] = left + 1;
            n += clothi_nodes_meet(a->node + left, a->node + left + 1);
        } else if (nb >= leaf_b || (na < leaf_a && a->node[na].lo[3] >= b->node[nb].lo[3])) {
            const clothi_box *other = b->node + nb;
            stack[n][0] = 2 * na;
            stack[n][1] = nb;
            n += clothi_nodes_meet(a->node + 2 * na, other);
            stack[n][0] = 2 * na + 1;
            stack[n][1] = nb;
            n += clothi_nodes_meet(a->node + 2 * na + 1, other);
        } else {
            const clothi_box *other = a->node + na;
            stack[n][0] = na;
            stack[n][1] = 2 * nb;
            n += clothi_nodes_meet(other, b->node + 2 * nb);
            stack[n][0] = na;
            stack[n][1] = 2 * nb + 1;
            n += clothi_nodes_meet(other, b->node + 2 * nb + 1);
        }
        if (n == 0) return;
        n--;
        na = stack[n][0];
        nb = stack[n][1];
    }
}

/* Task i of a cross query: a pair of nodes; of a self query: a pair with the first not after the
 * second, row by row of the triangle. */
static void clothi_bvh_query_range(int begin, int end, int worker, void *ctx) {
    const clothi_bvh_query *q = (const clothi_bvh_query *)ctx;
    const clothi_bvh       *b = q->b ? q->b : q->a;
    const int               width = 1 << q->level_b;
    int                     task, row = 0, at;
    (void)worker;
    for (task = begin; task < end; task++) {
        clothi_segment out = clothi_segment_open(q->pairs, task);
        int            na, nb;
        if (q->b) {
            na = (1 << q->level_a) + task / width;
            nb = width + task % width;
        } else {
            for (row = 0, at = task; at >= width - row; row++) at -= width - row;
            na = width + row;
            nb = na + at;
        }
        if (clothi_nodes_meet(q->a->node + na, b->node + nb))
            clothi_bvh_descend(q->a, na, b, nb, !q->b, &out);
        q->pairs->found[task] = out.found;
    }
}

/* Every pair i < j of items whose boxes overlap (touching included), once each.
 * out  pairs   count and pair [count x 2], in an order that the tree alone decides
 * returns CLOTH_OK, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY (more than an int counts); the list is
 *   empty then
 * contract: alloc when the list outgrows its memory | cost ~ O(n log n + pairs) for surfaces |
 *   same list for any worker count */
CLOTHI_UNUSED static cloth_status clothi_bvh_self_pairs(const cloth_hooks *hooks,
                                                        const clothi_bvh *t, clothi_pairs *pairs) {
    clothi_bvh_query q;
    int              width;
    q.a = t;
    q.b = NULL;
    q.pairs = pairs;
    q.level_a = q.level_b = t->depth < CLOTHI_BVH_TASKS ? t->depth : CLOTHI_BVH_TASKS;
    width = 1 << q.level_a;
    return clothi_pairs_run(hooks, &pairs, 1, width * (width + 1) / 2, 64, clothi_bvh_query_range,
                            &q);
}

/* Every pair (item of a, item of b) whose boxes overlap; otherwise as clothi_bvh_self_pairs. */
CLOTHI_UNUSED static cloth_status clothi_bvh_cross_pairs(const cloth_hooks *hooks,
                                                         const clothi_bvh *a, const clothi_bvh *b,
                                                         clothi_pairs *pairs) {
    clothi_bvh_query q;
    q.a = a;
    q.b = b;
    q.pairs = pairs;
    q.level_a = a->depth < CLOTHI_BVH_TASKS ? a->depth : CLOTHI_BVH_TASKS;
    q.level_b = b->depth < CLOTHI_BVH_TASKS ? b->depth : CLOTHI_BVH_TASKS;
    return clothi_pairs_run(hooks, &pairs, 1, 1 << (q.level_a + q.level_b), 64,
                            clothi_bvh_query_range, &q);
}

/* The items (first + i) whose boxes overlap box [6]: returns their number, writes the first max.
 * contract: alloc none | cost O(log n + found) */
CLOTHI_UNUSED static int clothi_bvh_box_query(const clothi_bvh *t, const double *box, int max,
                                              int *items) {
    clothi_box b;
    int        stack[CLOTHI_BVH_STACK], n = 0, count = 0, i, k;
    for (k = 0; k < 3; k++) {
        b.lo[k] = clothi_float_below(box[k]);
        b.hi[k] = clothi_float_above(box[3 + k]);
    }
    clothi_node_measure(&b);
    stack[n++] = 1;
    while (n) {
        const int node = stack[--n], leaf = node - (1 << t->depth);
        if (!clothi_nodes_meet(t->node + node, &b)) continue;
        if (leaf < 0) {
            stack[n++] = 2 * node + 1;
            stack[n++] = 2 * node;
            continue;
        }
        for (i = clothi_bvh_item(t, leaf, t->depth); i < clothi_bvh_item(t, leaf + 1, t->depth);
             i++) {
            if (!clothi_boxes_meet(t->exact + 6 * (size_t)i, box)) continue;
            if (count < max) items[count] = t->first + t->item[i];
            count++;
        }
    }
    return count;
}

/* Squared distance m^2 of a point [3] from an item (first + i). */
typedef double clothi_distance_fn(int item, const double *point, void *ctx);

static double clothi_node_distance2(const clothi_box *b, const double *p) {
    double d2 = 0;
    int    k;
    for (k = 0; k < 3; k++) {
        const double below = (double)b->lo[k] - p[k], above = p[k] - (double)b->hi[k];
        const double d = below > above ? below : above;
        if (d > 0) d2 += d * d;
    }
    return d2;
}

/* The item nearest to a point [3] by fn, if its squared distance is at most *d2; of several the
 * smallest. Returns it and sets *d2; returns -1 and leaves *d2 when there is none. fn must not be
 * less than the distance from the item's box by more than a relative 1e-9.
 * contract: alloc none | cost O(log n) for a point not far away as against the items' size */
CLOTHI_UNUSED static int clothi_bvh_nearest(const clothi_bvh *t, const double *point,
                                            clothi_distance_fn *fn, void *ctx, double *d2) {
    const double slack = 1 - 1e-9;
    int          stack[CLOTHI_BVH_STACK], n = 0, best = -1, i;
    double       reach[CLOTHI_BVH_STACK];
    stack[0] = 1;
    reach[n++] = slack * clothi_node_distance2(t->node + 1, point);
    while (n) {
        const int node = stack[--n], leaf = node - (1 << t->depth);
        if (reach[n] > *d2) continue;
        if (leaf < 0) {                     /* the nearer child on top */
            const double l = slack * clothi_node_distance2(t->node + 2 * node, point);
            const double r = slack * clothi_node_distance2(t->node + 2 * node + 1, point);
            const int    right_last = r < l;
            stack[n] = 2 * node + !right_last;
            reach[n++] = right_last ? l : r;
            stack[n] = 2 * node + right_last;
            reach[n++] = right_last ? r : l;
            continue;
        }
        for (i = clothi_bvh_item(t, leaf, t->depth); i < clothi_bvh_item(t, leaf + 1, t->depth);
             i++) {
            const int    item = t->first + t->item[i];
            const double d = fn(item, point, ctx);
            if (d < *d2 || (d <= *d2 && (best < 0 || item < best))) {
                *d2 = d;
                best = item;
            }
        }
    }
    return best;
}

/* --- features --- */

/* Vertices, edges and faces of any set of triangles, also one that is no surface. memset to 0
 * before the first build. A vertex without a face has no owner and is in no pair. */
typedef struct clothi_features {
    int            nv, ne, nf;
    const int     *faces;                   /* [nf x 3] borrowed                               */
    int           *edges;                   /* [ne x 2] a < b; sorted by a, then by b          */
    int           *face_edges;              /* [nf x 3] edge of corners k and k+1              */
    unsigned char *owned;                   /* [nf] bit k: corner k, bit 3+k: edge k is owned  */
} clothi_features;

CLOTHI_UNUSED static void clothi_features_free(const cloth_hooks *hooks, clothi_features *s) {
    clothi_free(hooks, s->edges);
    memset(s, 0, sizeof *s);
}

/* faces [nf x 3] are borrowed as long as *s lives; the smallest face owns.
 * returns CLOTH_OK; CLOTH_ERR_MESH: an index out of range, a corner twice; CLOTH_ERR_MEMORY;
 *   *s is empty then.   cost O(nv + nf) */
CLOTHI_UNUSED static cloth_status clothi_features_build(const cloth_hooks *hooks, int nv, int nf,
                                                        const int *faces, clothi_features *s) {
    clothi_edge_sort sort;
    cloth_status     status;
    int              i, end, h, ne = 0;
    memset(s, 0, sizeof *s);
    memset(&sort, 0, sizeof sort);
    status = clothi_check_counts(hooks, nv, nf);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status == CLOTH_OK) status = clothi_edge_sort_make(hooks, nv, nf, faces, &sort);
    if (status != CLOTH_OK) return status;
    for (i = 0; i < 3 * nf; i = clothi_edge_run(&sort, 3 * nf, i)) ne++;
    s->edges = (int *)clothi_alloc(hooks, (2 * (size_t)ne + 3 * (size_t)nf) * sizeof(int) +
                                              (size_t)nf, 1);
    if (!s->edges) {
        status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %i edges", ne);
        goto done;
    }
    s->nv = nv;
    s->nf = nf;
    s->faces = faces;
    s->face_edges = s->edges + 2 * (size_t)ne;
    s->owned = (unsigned char *)(s->face_edges + 3 * (size_t)nf);
    for (i = 0; i < 3 * nf; i = end, s->ne++) {
        end = clothi_edge_run(&sort, 3 * nf, i);
        h = sort.order[i];
        s->edges[2 * s->ne] = sort.lo[h];
        s->edges[2 * s->ne + 1] = sort.hi[h];
        s->owned[h / 3] = (unsigned char)(s->owned[h / 3] | 8 << h % 3);
        for (; i < end; i++) s->face_edges[sort.order[i]] = s->ne;
    }
    memset(sort.count, 0, (size_t)nv * sizeof(int));
    for (h = 0; h < 3 * nf; h++) {
        if (sort.count[faces[h]]++) continue;
        s->owned[h / 3] = (unsigned char)(s->owned[h / 3] | 1 << h % 3);
    }
done:
    clothi_edge_sort_free(hooks, &sort);
    return status;
}

#define CLOTHI_FEATURE_CHUNK 1024           /* face pairs that a task takes                    */

typedef struct clothi_features_job {
    const clothi_features *s;
    const clothi_pairs    *faces;
    const double          *box;             /* [nv x 6]                                        */
    clothi_pairs          *vf, *ee;
} clothi_features_job;

/* A face with its boxes. */
typedef struct clothi_face_view {
    const int *v, *e;
    int        face, owned;
    double     box[6], edge[3][6];
} clothi_face_view;

static void clothi_face_look(const clothi_features_job *job, int face, clothi_face_view *w) {
    int k;
    w->face = face;
    w->v = job->s->faces + 3 * (size_t)face;
    w->e = job->s->face_edges + 3 * (size_t)face;
    w->owned = job->s->owned[face];
    for (k = 0; k < 3; k++)
        clothi_box_join(job->box + 6 * (size_t)w->v[k], job->box + 6 * (size_t)w->v[(k + 1) % 3],
                        w->edge[k]);
    clothi_box_join(w->edge[0], w->edge[1], w->box);
}

/* The vertices that f owns against face g. */
static void clothi_feature_vf(const clothi_features_job *job, const clothi_face_view *f,
                              const clothi_face_view *g, clothi_segment *out) {
    int k;
    for (k = 0; k < 3; k++) {
        const int v = f->v[k];
        if (!(f->owned >> k & 1) || v == g->v[0] || v == g->v[1] || v == g->v[2]) continue;
        if (clothi_boxes_meet(job->box + 6 * (size_t)v, g->box))
            clothi_segment_put(out, v, g->face);
    }
}

/* The edges that f owns against those that g owns. */
static void clothi_feature_ee(const clothi_face_view *f, const clothi_face_view *g,
                              clothi_segment *out) {
    int k, l;
    for (k = 0; k < 3; k++) {
        const int a = f->v[k], b = f->v[(k + 1) % 3];
        if (!(f->owned >> (3 + k) & 1) || !clothi_boxes_meet(f->edge[k], g->box)) continue;
        for (l = 0; l < 3; l++) {
            const int c = g->v[l], d = g->v[(l + 1) % 3];
            if (!(g->owned >> (3 + l) & 1) || a == c || a == d || b == c || b == d) continue;
            if (clothi_boxes_meet(f->edge[k], g->edge[l]))
                clothi_segment_put(out, f->e[k] < g->e[l] ? f->e[k] : g->e[l],
                                   f->e[k] < g->e[l] ? g->e[l] : f->e[k]);
        }
    }
}

static void clothi_features_range(int begin, int end, int worker, void *ctx) {
    const clothi_features_job *job = (const clothi_features_job *)ctx;
    int task;
    (void)worker;
    for (task = begin; task < end; task++) {
        const int n = job->faces->count;
        const int last = n - task * CLOTHI_FEATURE_CHUNK < CLOTHI_FEATURE_CHUNK
                             ? n : (task + 1) * CLOTHI_FEATURE_CHUNK;
        clothi_segment   vf = clothi_segment_open(job->vf, task);
        clothi_segment   ee = clothi_segment_open(job->ee, task);
        clothi_face_view f, g;
        int              i;
        f.face = -1;
        for (i = task * CLOTHI_FEATURE_CHUNK; i < last; i++) {
            const int *pair = job->faces->pair + 2 * (size_t)i;
            if (pair[0] != f.face) clothi_face_look(job, pair[0], &f);
            clothi_face_look(job, pair[1], &g);
            clothi_feature_vf(job, &f, &g, &vf);
            clothi_feature_vf(job, &g, &f, &vf);
            clothi_feature_ee(&f, &g, &ee);
        }
        job->vf->found[task] = vf.found;
        job->ee->found[task] = ee.found;
    }
}

/* From pairs of faces to the pairs (vertex, face) and (edge, edge), smaller edge first, whose boxes
 * overlap and that share no vertex; each once if each pair of faces is there once.
 * in   faces       pairs of faces of s, in its numbering. All those that the boxes allow between
 *                  two groups of faces: leaving single ones out loses features of their neighbours
 * in   vertex_box  [nv x 6] the boxes that the pairs of faces were made from (clothi_swept_boxes)
 * out  vf, ee      count and pair [count x 2]
 * returns CLOTH_OK, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY; both lists empty then
 * contract: alloc when a list outgrows its memory | cost O(pairs) | same lists for any worker
 *   count */
CLOTHI_UNUSED static cloth_status clothi_pairs_features(const cloth_hooks *hooks,
                                                        const clothi_features *s,
                                                        const clothi_pairs *faces,
                                                        const double *vertex_box, clothi_pairs *vf,
                                                        clothi_pairs *ee) {
    clothi_features_job job;
    clothi_pairs       *list[2];
    job.s = s;
    job.faces = faces;
    job.box = vertex_box;
    job.vf = list[0] = vf;
    job.ee = list[1] = ee;
    return clothi_pairs_run(hooks, list, 2,
                            faces->count / CLOTHI_FEATURE_CHUNK +
                                (faces->count % CLOTHI_FEATURE_CHUNK != 0),
                            2 * CLOTHI_FEATURE_CHUNK, clothi_features_range, &job);
}

/* ===== [5.2] TRIANGLES THAT INTERSECT ======================================================== */

/* ===== [6.1] QUADRATIC PROGRAM =============================================================== */

/* ===== [7.1] DISTANCE GRID ===================================================================
 *
 *            z                      The sign of a node is that of its winding number: how often
 *            |    _____             the surface wraps round it. On a closed mesh that is counted
 *       o--o-|-o-/--o--\-o--o-> +x  along a ray: each crossing from inside to outside adds 1, from
 *            | _|___   |            outside to inside takes 1. Two bodies that overlap: 1, 2, 1;
 *       0  0 |/ 1 2 \ 1/ 0  0       inside is where it is 1 or more, the union.
 *            |\_____/_/
 *
 *   symbols   (w, u, v)  an axis and the two that follow it cyclically; p the node
 *   in the plane of u and v a triangle winds round p by [up edge beyond p] - [down edge beyond p],
 *     'beyond' seen along +u, where an edge counts when it passes from v <= p.v to v > p.v; then
 *     the line p + t e_w crosses the triangle at w = depth, outwards for +1 (normal along +w)
 *   winding(p) = sum over triangles with depth > p.w                            [JKS13] eq. (2),
 *     whose solid angles over 4 pi sum to the same integer on a closed mesh
 *
 * Rounding. An edge's crossing is computed from its lower end, whichever face asks: the two faces
 * at it get the same bits, their counts cancel and the sum along a whole line is exactly 0. The
 * numbers computed are those of a point within rounding of p: only a node within rounding of the
 * surface can get a wrong sign. A row of nodes is one line: every crossing is noted at the node
 * before it and summed along the row. The generalised winding number by solid angles, exact or by
 * a tree of dipoles [BDSLJ18], costs hundreds of flops a node and is not an integer; it is for
 * meshes with holes, which are refused here.
 *
 * Distance. Blocks of 4 x 4 x 4 nodes: one nearest-face query from the centre tells a block that is
 * beyond the band; else one query a node, which starts from the face nearest to the last. Faces
 * inside another part [7.2] are left out: the nearest point is on the boundary of the union, but
 * for nodes inside the overlap that are nearer to the inner half of a face at its border.
 *
 * [JKS13] Jacobson, Kavan, Sorkine-Hornung: Robust Inside-Outside Segmentation using Generalized
 * Winding Numbers, SIGGRAPH 2013.  [BDSLJ18] Barill, Dickson, Schmidt, Levin, Jacobson: Fast
 * Winding Numbers for Soups and Clouds, SIGGRAPH 2018.
 * checked: tests/test_grid.c */

#define CLOTHI_GRID_COOKIE  0x64697267u
#define CLOTHI_GRID_BLOCK   4               /* nodes along an edge of a block                  */
#define CLOTHI_GRID_TINY    1e-60           /* m, smallest cell: squares and cubes stay normal */
#define CLOTHI_GRID_LARGE   1e60            /* m, largest coordinate                           */
#define CLOTHI_GRID_REACH   1e11            /* cells, largest coordinate                       */

/* [7.2] */
static cloth_status clothi_inside_covered(const cloth_hooks *hooks, int nv, const double *x,
                                          int nf, const int *faces, unsigned char *covered);

typedef struct clothi_grid {
    cloth_grid  grid;                       /* first: the public pointer is ours               */
    cloth_hooks hooks;
} clothi_grid;

/* The line through (u, v) = (pu, pv) along axis w against triangle a b c: 1 when it leaves the
 * side of the normal, -1 when it enters there, 0 when it misses. *depth: its w. */
static int clothi_line_cross(const double *a, const double *b, const double *c, int w, double pu,
                             double pv, double *depth) {
    const int     u = w == 2 ? 0 : w + 1, v = w == 0 ? 2 : w - 1;
    const double *corner[4];
    double        at[2] = {0, 0}, deep[2] = {0, 0};         /* of the down edge, of the up edge */
    int           k, any = 0, turn;
    corner[0] = corner[3] = a;
    corner[1] = b;
    corner[2] = c;
    for (k = 0; k < 3; k++) {
        const int     up = corner[k][v] <= pv;
        const double *lo = corner[up ? k : k + 1], *hi = corner[up ? k + 1 : k];
        double        t;
        if (up == (corner[k + 1][v] <= pv)) continue;
        t = (pv - lo[v]) / (hi[v] - lo[v]);
        at[up] = lo[u] + t * (hi[u] - lo[u]);
        deep[up] = lo[w] + t * (hi[w] - lo[w]);
        any = 1;
    }
    if (!any) return 0;
    turn = (at[1] > pu) - (at[0] > pu);
    if (turn) *depth = deep[0] + (pu - at[0]) / (at[1] - at[0]) * (deep[1] - deep[0]);
    return turn;
}

/* Union-find: the root of i; paths are halved on the way. */
static int clothi_root(int *up, int i) {
    while (up[i] != i) {
        up[i] = up[up[i]];
        i = up[i];
    }
    return i;
}

/* closed [nf] = 1 for the faces of components (joined along edges) at all of whose edges as many
 * faces run one way as the other; *open: a half-edge where that fails, -1 when it holds
 * everywhere. Indices are in range. */
static cloth_status clothi_closed_faces(const cloth_hooks *hooks, int nv, int nf, const int *faces,
                                        unsigned char *closed, int *open) {
    clothi_edge_sort s;
    cloth_status     status;
    int             *up = NULL, i, j, end, f;
    *open = -1;
    status = clothi_edge_sort_make(hooks, nv, nf, faces, &s);
    if (status != CLOTH_OK) return status;
    up = (int *)clothi_alloc(hooks, (size_t)nf, sizeof(int));
    if (!up) {
        status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for the parts of %i faces", nf);
        goto done;
    }
    for (f = 0; f < nf; f++) up[f] = f;
    for (i = 0; i < 3 * nf; i = end) {
        end = clothi_edge_run(&s, 3 * nf, i);
        for (j = i + 1; j < end; j++) {
            const int a = clothi_root(up, s.order[i] / 3), b = clothi_root(up, s.order[j] / 3);
            up[a > b ? a : b] = a > b ? b : a;
        }
    }
    for (f = 0; f < nf; f++) closed[f] = 1;
    for (i = 0; i < 3 * nf; i = end) {
        int sum = 0;
        end = clothi_edge_run(&s, 3 * nf, i);
        for (j = i; j < end; j++) {
            const int a = faces[s.order[j]], b = faces[clothi_halfedge_next(s.order[j])];
            sum += (a < b) - (a > b);
        }
        if (sum == 0) continue;
        if (*open < 0 || s.order[i] < *open) *open = s.order[i];
        closed[clothi_root(up, s.order[i] / 3)] = 0;
    }
    for (f = 0; f < nf; f++) closed[f] = closed[clothi_root(up, f)];
done:
    clothi_free(hooks, up);
    clothi_edge_sort_free(hooks, &s);
    return status;
}

/* --- signs --- */

typedef struct clothi_grid_job {
    cloth_grid   *grid;
    const double *x;
    const int    *faces;
    int           nf;
    int           blocks[3];
    int          *kept;                     /* [tree.n] faces that distances are taken to      */
    clothi_bvh    tree;                     /* of their boxes                                  */
} clothi_grid_job;

/* Nodes along an axis that may lie in [lo, hi]: one to spare on either side. */
static void clothi_grid_span(const cloth_grid *g, int axis, double lo, double hi, int *begin,
                             int *end) {
    const double a = floor((lo - g->origin[axis]) / g->cell) - 1;
    const double b = ceil((hi - g->origin[axis]) / g->cell) + 2;
    *begin = a > 0 ? (int)a : 0;
    *end = b < g->n[axis] ? (int)b : g->n[axis];
}

/* Notes one triangle's crossings in the rows of slab k. */
static void clothi_grid_rows(const cloth_grid *g, const double *const c[3], int k) {
    const double z = g->origin[2] + g->cell * k;
    const double lo = clothi_min(c[0][1], clothi_min(c[1][1], c[2][1]));
    const double hi = clothi_max(c[0][1], clothi_max(c[1][1], c[2][1]));
    int          j, end;
    clothi_grid_span(g, 1, lo, hi, &j, &end);
    for (; j < end; j++) {
        double depth = 0, before;
        int    turn = clothi_line_cross(c[0], c[1], c[2], 0, g->origin[1] + g->cell * j, z, &depth);
        if (!turn) continue;
        before = ceil((depth - g->origin[0]) / g->cell) - 1;    /* the last node before it */
        if (!(before >= 0)) continue;
        if (before > g->n[0] - 1) before = g->n[0] - 1;
        g->phi[((size_t)k * (size_t)g->n[1] + (size_t)j) * (size_t)g->n[0] + (size_t)before]
            += turn;
    }
}

/* phi of slabs [begin, end) = winding numbers. */
static void clothi_grid_wind(int begin, int end, int worker, void *ctx) {
    const clothi_grid_job *job = (const clothi_grid_job *)ctx;
    const cloth_grid      *g = job->grid;
    const size_t           nx = (size_t)g->n[0], rows = (size_t)g->n[1] * (size_t)(end - begin);
    double                *row = g->phi + (size_t)begin * (size_t)g->n[1] * nx;
    size_t                 r, i;
    int                    f, k, last;
    (void)worker;
    for (f = 0; f < job->nf; f++) {
        const double *c[3];
        for (k = 0; k < 3; k++) c[k] = job->x + 3 * job->faces[3 * f + k];
        clothi_grid_span(g, 2, clothi_min(c[0][2], clothi_min(c[1][2], c[2][2])),
                         clothi_max(c[0][2], clothi_max(c[1][2], c[2][2])), &k, &last);
        if (k < begin) k = begin;
        if (last > end) last = end;
        for (; k < last; k++) clothi_grid_rows(g, c, k);
    }
    for (r = 0; r < rows; r++, row += nx)
        for (i = nx - 1; i-- > 0;) row[i] += row[i + 1];
}

/* --- distances --- */

/* Squared distance of p from the segment a b. */
static double clothi_grid_segment2(const double *p, const double *a, const double *b) {
    double e[3], d[3], t, l2;
    clothi_sub3(b, a, e);
    clothi_sub3(p, a, d);
    l2 = clothi_dot3(e, e);
    t = clothi_dot3(d, e);
    t = l2 > 0 && t > 0 ? t < l2 ? t / l2 : 1 : 0;
    d[0] -= t * e[0];
    d[1] -= t * e[1];
    d[2] -= t * e[2];
    return clothi_dot3(d, d);
}

/* Squared distance of a node from a face: from its plane above the face, else from its edges. */
static double clothi_grid_face2(int item, const double *p, void *ctx) {
    const clothi_grid_job *job = (const clothi_grid_job *)ctx;
    const int    *v = job->faces + 3 * job->kept[item];
    const double *c[4];
    double        e[3], d[3], n[3], side[3], d2, high;
    int           i, inside = 1;
    for (i = 0; i < 3; i++) c[i] = job->x + 3 * v[i];
    c[3] = c[0];
    clothi_sub3(c[1], c[0], e);
    clothi_sub3(c[2], c[0], d);
    clothi_cross3(e, d, n);
    for (i = 0; i < 3; i++) {
        clothi_sub3(c[i + 1], c[i], e);
        clothi_sub3(p, c[i], d);
        clothi_cross3(e, d, side);
        inside &= clothi_dot3(side, n) > 0;
    }
    if (inside) {
        high = clothi_dot3(d, n);
        return high * high / clothi_dot3(n, n);
    }
    d2 = clothi_grid_segment2(p, c[0], c[1]);
    d2 = clothi_min(d2, clothi_grid_segment2(p, c[1], c[2]));
    return clothi_min(d2, clothi_grid_segment2(p, c[2], c[0]));
}

/* Distance of p from the mesh if below `bound`, else `bound`. *item: a guess of the nearest (-1:
 * none), which makes the search short, and the answer. */
static double clothi_grid_reach(const clothi_grid_job *job, const double *p, double bound,
                                int *item) {
    clothi_grid_job here = *job;            /* the tree's hook wants it writable               */
    double          d2 = bound * bound;
    int             found;
    if (*item >= 0) d2 = clothi_min(d2, clothi_grid_face2(*item, p, &here));
    found = clothi_bvh_nearest(&job->tree, p, clothi_grid_face2, &here, &d2);
    if (found >= 0) *item = found;
    return found < 0 ? bound : clothi_min(bound, sqrt(d2));
}

/* The nodes of one block; phi holds winding numbers and gets signed distances. */
static void clothi_grid_block(const clothi_grid_job *job, const int *first) {
    const cloth_grid *g = job->grid;
    double            p[3], half = 0, bound;
    int               last[3], i, j, k, a, item = -1, near_by;
    for (a = 0; a < 3; a++) {
        last[a] = first[a] + CLOTHI_GRID_BLOCK < g->n[a] ? first[a] + CLOTHI_GRID_BLOCK : g->n[a];
        p[a] = g->origin[a] + g->cell * 0.5 * (first[a] + last[a] - 1);
        half += (double)(last[a] - 1 - first[a]) * (last[a] - 1 - first[a]);
    }
    /* to the corners, and more than the coordinates round */
    bound = g->band + g->cell * (0.5 * sqrt(half) + 0.01);
    near_by = clothi_grid_reach(job, p, bound, &item) < bound;
    for (k = first[2]; k < last[2]; k++)
        for (j = first[1]; j < last[1]; j++) {
            double *phi = g->phi + ((size_t)k * (size_t)g->n[1] + (size_t)j) * (size_t)g->n[0];
            p[1] = g->origin[1] + g->cell * j;
            p[2] = g->origin[2] + g->cell * k;
            for (i = first[0]; i < last[0]; i++) {
                double d = g->band;
                p[0] = g->origin[0] + g->cell * i;
                if (near_by) d = clothi_grid_reach(job, p, d, &item);
                phi[i] = phi[i] >= 0.5 ? -d : d;
            }
        }
}

static void clothi_grid_measure(int begin, int end, int worker, void *ctx) {
    const clothi_grid_job *job = (const clothi_grid_job *)ctx;
    int                    b;
    (void)worker;
    for (b = begin; b < end; b++) {
        int first[3];
        first[0] = CLOTHI_GRID_BLOCK * (b % job->blocks[0]);
        first[1] = CLOTHI_GRID_BLOCK * (b / job->blocks[0] % job->blocks[1]);
        first[2] = CLOTHI_GRID_BLOCK * (b / job->blocks[0] / job->blocks[1]);
        clothi_grid_block(job, first);
    }
}

/* --- create --- */

static cloth_status clothi_grid_check_size(const cloth_hooks *hooks, const char *name, double a,
                                           double least) {
    if (!clothi_finite(a))
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "grid desc.%s = %g", name, a);
    if (a >= least) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "grid desc.%s = %g is below %g", name, a, least);
}

/* The desc's mesh: indices, numbers, closed, volume. */
static cloth_status clothi_grid_check_mesh(const cloth_grid_desc *d, const double *centre) {
    const cloth_hooks *hooks = &d->hooks;
    unsigned char     *closed;
    cloth_status       status;
    double             volume = 0;
    int                f, open = -1;
    closed = (unsigned char *)clothi_alloc(hooks, (size_t)d->nf, 1);
    if (!closed)
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to check %i faces", d->nf);
    status = clothi_closed_faces(hooks, d->nv, d->nf, d->faces, closed, &open);
    clothi_free(hooks, closed);
    if (status != CLOTH_OK) return status;
    if (open >= 0)
        return clothi_fail(hooks, CLOTH_ERR_MESH, "the mesh is not closed: at edge %i %i of "
                           "faces[%i] as many faces must run one way as the other",
                           d->faces[open], d->faces[clothi_halfedge_next(open)], open / 3);
    for (f = 0; f < d->nf; f++) {
        double a[3], b[3], c[3], n[3];
        clothi_sub3(d->x + 3 * d->faces[3 * f], centre, a);
        clothi_sub3(d->x + 3 * d->faces[3 * f + 1], centre, b);
        clothi_sub3(d->x + 3 * d->faces[3 * f + 2], centre, c);
        clothi_cross3(b, c, n);
        volume += clothi_dot3(a, n) / 6;
    }
    if (volume > 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_MESH, "the mesh holds a volume of %g m^3: faces must turn "
                       "counter-clockwise seen from outside", volume);
}

/* Numbers and indices; the box of the faces' corners: lo [3], hi [3]. */
static cloth_status clothi_grid_box(const cloth_grid_desc *d, double *lo, double *hi) {
    const cloth_hooks *hooks = &d->hooks;
    const ptrdiff_t    bad = clothi_find_nonfinite(d->x, 3 * (size_t)d->nv);
    int                i, a;
    cloth_status       status;
    if (bad >= 0)
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "grid desc.x[%i] = %g", (int)bad,
                           d->x[bad]);
    status = clothi_check_faces(hooks, d->nv, d->nf, d->faces);
    for (i = 0; i < 3 * d->nf && status == CLOTH_OK; i++) {
        const double *x = d->x + 3 * d->faces[i];
        for (a = 0; a < 3; a++) {
            lo[a] = i == 0 || x[a] < lo[a] ? x[a] : lo[a];
            hi[a] = i == 0 || x[a] > hi[a] ? x[a] : hi[a];
            if (fabs(x[a]) <= clothi_min(CLOTHI_GRID_LARGE, CLOTHI_GRID_REACH * d->cell))
                continue;
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "grid desc.x[%i] = %g is too large for "
                               "cells of %g", 3 * d->faces[i] + a, x[a], d->cell);
        }
    }
    return status;
}

/* Checks the desc and lays the grid out: all of g but phi. */
static cloth_status clothi_grid_plan(const cloth_grid_desc *d, cloth_grid *g) {
    const cloth_hooks *hooks = &d->hooks;
    const size_t       most = d->max_nodes ? d->max_nodes : CLOTH_DEFAULT_GRID_MAX_NODES;
    double             lo[3] = {0, 0, 0}, hi[3] = {0, 0, 0}, centre[3], margin, nodes = 1, n[3];
    cloth_status       status = clothi_check_counts(hooks, d->nv, d->nf);
    int                a;
    if (status != CLOTH_OK) return status;
    if (!d->x || !d->faces || d->nf < 4)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, !d->x || !d->faces
                           ? "grid desc.x or desc.faces is NULL" : "grid desc.nf = %i is below 4",
                           d->nf);
    status = clothi_grid_check_size(hooks, "cell", d->cell, CLOTHI_GRID_TINY);
    if (status != CLOTH_OK) return status;
    g->cell = d->cell;
    g->band = d->band != 0 ? d->band : CLOTH_DEFAULT_GRID_BAND * d->cell;
    status = clothi_grid_check_size(hooks, "band", g->band, 2 * d->cell);
    if (status != CLOTH_OK) return status;
    margin = d->margin != 0 ? d->margin : g->band;
    status = clothi_grid_check_size(hooks, "margin", margin, d->cell);
    if (status == CLOTH_OK) status = clothi_grid_box(d, lo, hi);
    if (status != CLOTH_OK) return status;
    for (a = 0; a < 3; a++) {
        n[a] = ceil((hi[a] - lo[a] + 2 * margin) / d->cell) + 1;
        centre[a] = lo[a] + 0.5 * (hi[a] - lo[a]);
        nodes *= n[a];
    }
    if (!(nodes <= (double)most) || !(nodes < 2147483648.0))
        return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "cells of %g m make %g nodes, more than %g",
                           d->cell, nodes, clothi_min((double)most, 2147483647.0));
    for (a = 0; a < 3; a++) {
        g->n[a] = (int)n[a];
        g->origin[a] = centre[a] - 0.5 * d->cell * (n[a] - 1);
    }
    return clothi_grid_check_mesh(d, centre);
}

CLOTH_API cloth_grid_desc cloth_grid_desc_default(void) {
    cloth_grid_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = CLOTHI_GRID_COOKIE;
    return d;
}

/* The tree of the faces that do not lie inside another part of the mesh. */
static cloth_status clothi_grid_faces(const cloth_grid_desc *d, clothi_grid_job *job) {
    const cloth_hooks *hooks = &d->hooks;
    unsigned char     *covered = (unsigned char *)clothi_alloc(hooks, (size_t)d->nf, 1);
    double            *box = (double *)clothi_alloc(hooks, 6 * (size_t)d->nf, sizeof(double));
    cloth_status       status = CLOTH_ERR_MEMORY;
    int                f, n = 0, a, i;
    job->kept = (int *)clothi_alloc(hooks, (size_t)d->nf, sizeof(int));
    if (!covered || !box || !job->kept) {
        clothi_fail(hooks, status, "no memory for the boxes of %i faces", d->nf);
        goto done;
    }
    status = clothi_inside_covered(hooks, d->nv, d->x, d->nf, d->faces, covered);
    if (status != CLOTH_OK) goto done;
    for (f = 0; f < d->nf; f++) {
        double *b = box + 6 * n;
        if (covered[f]) continue;
        for (a = 0; a < 3; a++) {
            b[a] = b[3 + a] = d->x[3 * d->faces[3 * f] + a];
            for (i = 1; i < 3; i++) {
                b[a] = clothi_min(b[a], d->x[3 * d->faces[3 * f + i] + a]);
                b[3 + a] = clothi_max(b[3 + a], d->x[3 * d->faces[3 * f + i] + a]);
            }
        }
        job->kept[n++] = f;
    }
    status = clothi_bvh_build(hooks, n, box, &job->tree);
done:
    clothi_free(hooks, covered);
    clothi_free(hooks, box);
    return status;
}

static clothi_grid *clothi_grid_alloc(const cloth_hooks *hooks, const cloth_grid *plan) {
    const size_t nodes = (size_t)plan->n[0] * (size_t)plan->n[1] * (size_t)plan->n[2];
    const size_t head = (sizeof(clothi_grid) + sizeof(double) - 1) / sizeof(double);
    clothi_grid *g = (clothi_grid *)clothi_alloc(hooks, nodes + head, sizeof(double));
    if (!g) {
        clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for a grid of %z nodes", nodes);
        return NULL;
    }
    g->grid = *plan;
    g->grid.phi = (double *)(void *)g + head;
    g->hooks = *hooks;
    return g;
}

CLOTH_API cloth_status cloth_grid_create(const cloth_grid_desc *desc, cloth_grid **out) {
    cloth_grid      plan;
    clothi_grid    *made = NULL;
    clothi_grid_job job;
    cloth_status    status;
    int             a;
    if (!out) return CLOTH_ERR_ARGUMENT;
    *out = NULL;
    if (!desc) return CLOTH_ERR_ARGUMENT;
    if (desc->cookie != CLOTHI_GRID_COOKIE) return CLOTH_ERR_UNINIT;
    memset(&plan, 0, sizeof plan);
    memset(&job, 0, sizeof job);
    status = clothi_grid_plan(desc, &plan);
    if (status != CLOTH_OK) return status;
    made = clothi_grid_alloc(&desc->hooks, &plan);
    status = made ? clothi_grid_faces(desc, &job) : CLOTH_ERR_MEMORY;
    if (status != CLOTH_OK) goto done;
    job.grid = &made->grid;
    job.x = desc->x;
    job.faces = desc->faces;
    job.nf = desc->nf;
    for (a = 0; a < 3; a++) job.blocks[a] = (plan.n[a] - 1) / CLOTHI_GRID_BLOCK + 1;
    clothi_for(&desc->hooks, plan.n[2], 8, clothi_grid_wind, &job);
    clothi_for(&desc->hooks, job.blocks[0] * job.blocks[1] * job.blocks[2], 64,
               clothi_grid_measure, &job);
    *out = &made->grid;
    made = NULL;
done:
    clothi_bvh_free(&desc->hooks, &job.tree);
    clothi_free(&desc->hooks, job.kept);
    clothi_free(&desc->hooks, made);
    return status;
}

CLOTH_API void cloth_grid_destroy(cloth_grid *grid) {
    cloth_hooks hooks;
    if (!grid) return;
    hooks = ((clothi_grid *)(void *)grid)->hooks;
    clothi_free(&hooks, grid);
}

CLOTH_API size_t cloth_grid_bytes(const cloth_grid *grid) { return clothi_block_size(grid); }

/* --- sample --- */

/* phi and its gradient in the cell at i, f in [0, 1] the place in it. */
static double clothi_grid_cell(const cloth_grid *g, const int *i, const double *f, double *grad) {
    const size_t  nx = (size_t)g->n[0], ny = (size_t)g->n[1];
    const double *p = g->phi + ((size_t)i[2] * ny + (size_t)i[1]) * nx + (size_t)i[0];
    double        v[4], dx[4], y0, y1;              /* the four edges along x: (j, k) = j + 2 k */
    int           e;
    for (e = 0; e < 4; e++) {
        const double *q = p + ((size_t)(e >> 1) * ny + (size_t)(e & 1)) * nx;
        dx[e] = q[1] - q[0];
        v[e] = q[0] + f[0] * dx[e];
    }
    y0 = v[0] + f[1] * (v[1] - v[0]);
    y1 = v[2] + f[1] * (v[3] - v[2]);
    grad[0] = ((1 - f[2]) * (dx[0] + f[1] * (dx[1] - dx[0]))
               + f[2] * (dx[2] + f[1] * (dx[3] - dx[2]))) / g->cell;
    grad[1] = ((1 - f[2]) * (v[1] - v[0]) + f[2] * (v[3] - v[2])) / g->cell;
    grad[2] = (y1 - y0) / g->cell;
    return y0 + f[2] * (y1 - y0);
}

CLOTH_API cloth_status cloth_grid_sample(const cloth_grid *grid, const double x[3],
                                         double *distance, double gradient[3]) {
    double f[3], out[3], grad[3], phi, size = 0, far;
    int    i[3], a;
    if (!grid || !x) return CLOTH_ERR_ARGUMENT;
    for (a = 0; a < 3; a++)
        if (!clothi_finite(x[a])) return CLOTH_ERR_NONFINITE;
    for (a = 0; a < 3; a++) {
        const double s = x[a] - grid->origin[a], top = grid->cell * (grid->n[a] - 1);
        const double q = s < 0 ? 0 : s > top ? top : s, t = q / grid->cell;
        out[a] = s - q;
        size = clothi_max(size, fabs(out[a]));
        i[a] = t < grid->n[a] - 1 ? (int)t : grid->n[a] - 2;
        f[a] = t - i[a];
    }
    phi = clothi_grid_cell(grid, i, f, grad);
    if (size > 0) {                         /* outside the box: scaled, squares may overflow    */
        phi = clothi_max(phi, 0);
        size = clothi_max(size, phi);
        far = phi / size * (phi / size);
        for (a = 0; a < 3; a++) far += out[a] / size * (out[a] / size);
        far = sqrt(far);
        for (a = 0; a < 3; a++)
            grad[a] = (out[a] != 0 ? out[a] / size : phi / size * grad[a]) / far;
        phi = size > CLOTHI_HUGE / 2 ? CLOTHI_HUGE : size * far;
    }
    if (distance) *distance = phi;
    if (gradient) memcpy(gradient, grad, sizeof grad);
    return CLOTH_OK;
}

/* ===== [7.2] OBSTACLES THAT PENETRATE THEMSELVES =============================================
 *
 *        ___________                   A walking body cuts through itself at armpits, elbows and
 *       /    A   ___\______            crotch. Cloth caught there would be told to be outside of
 *      |        /xxxxo     \           two surfaces at once, which is impossible: the faces marked
 *      |       |xxxxx|  B   |          x lie inside the body and are no obstacle, nor are those
 *       \_______o xx/      /           that cut through others (o). Both are exempt from contact
 *                 \_______/            for the step and counted in its report.
 *
 * Rule. A face is exempt in a pose when
 *   it cuts another face: they meet away from the vertex they may share, and each has corners on
 *   both sides of the other (exact signs [3.1]; touching is no cut);
 *   or the winding number just outside of it is 1 or more [7.1].
 * An edge or a vertex is exempt when all its faces are.
 *
 * Just outside: along the normal from the face, whose own jump from 1 to 0 lies behind. A ray from
 * the centroid counts the crossings of the others along the axis nearest to the normal, so that
 * the face is behind whatever rounding does. The number cannot change along the surface but where
 * it meets a cut: faces joined by edges, cut faces left out, form regions of one number. Faces
 * that share a vertex are tested too: a cut may run through such a pair, and left out it would be
 * a hole in the border of a region. So would be a pair that only touches, edge on edge, as in a
 * body and its mirror image: touched faces are left out as well and get rays of their own. At
 * least 16 rays a region, spread over its faces, must agree; if they do not (parts that lie flat
 * on each other) each face of the region gets its own. Rays for all faces say the same; they cost
 * 25 ms instead of 0.3 for a body of 27 000 faces, whose pairs of boxes cost 5.
 *
 * A step that sweeps from pose A to pose B exempts what is exempt in A or in B: a face that dives
 * under during the step must let go at once, and one that comes up may not catch what it met down
 * there before the step's end. What is inside only between A and B is not exempt. Nothing is
 * exempt longer than the step.
 *
 * Closed components (faces joined along edges, at each of which as many run one way as the other)
 * have an inside; faces of open ones have none, but may cut or lie in a closed one. A component
 * turned inside out is a room: it winds -1, nothing is inside.
 *
 * checked: tests/test_inside.c */

#define CLOTHI_INSIDE_GRAIN 2048            /* faces or pairs a range                          */
#define CLOTHI_INSIDE_HITS  256             /* boxes on one ray; more: all faces are asked     */

#define CLOTHI_INSIDE_RAYS    16            /* of a region, at least: all when it has fewer    */
#define CLOTHI_INSIDE_OFF     1e-12         /* of the largest coordinate                       */
#define CLOTHI_INSIDE_UNKNOWN (-CLOTH_MAX_COUNT)
#define CLOTHI_INSIDE_MIXED   CLOTH_MAX_COUNT

enum { CLOTHI_INSIDE_CUT = 1, CLOTHI_INSIDE_COVERED = 2, CLOTHI_INSIDE_TOUCHED = 4 };

typedef struct clothi_inside {
    cloth_hooks    hooks;
    int            nv, nf, ne;
    int           *faces;                   /* [nf x 3]                                        */
    int           *edge_start;              /* [ne + 1] ranges of edge_face                    */
    int           *edge_face;               /* [3 nf] faces around each edge                   */
    int           *up;                      /* [nf] union-find                                 */
    int           *size, *asked;            /* [nf] of a region: faces; those that came by     */
    int           *wind;                    /* [nf] of a region: winding number outside        */
    double        *x;                       /* [nv x 3] the pose that flags belong to          */
    double        *box;                     /* [nf x 6] lo, hi                                 */
    double        *normal;                  /* [nf x 3] twice the area                         */
    unsigned char *closed;                  /* [nf] of a closed component                      */
    unsigned char *flags;                   /* [nf] CLOTHI_INSIDE_ bits of pose x              */
    unsigned char *before;                  /* [nf] those of the step's first pose             */
    unsigned char *hit;                     /* [hits] how this pair of faces meets             */
    size_t         hits;
    double         reach;                   /* m, largest coordinate                           */
    int            known;                   /* flags are those of x                            */
    int            rays, regions;           /* of the last pose                                */
    clothi_bvh     tree;
    clothi_pairs   pairs;
} clothi_inside;

CLOTHI_UNUSED static void clothi_inside_free(clothi_inside *work) {
    cloth_hooks hooks;
    if (!work) return;
    hooks = work->hooks;
    clothi_bvh_free(&hooks, &work->tree);
    clothi_pairs_free(&hooks, &work->pairs);
    clothi_free(&hooks, work->faces);
    clothi_free(&hooks, work->x);
    clothi_free(&hooks, work->closed);
    clothi_free(&hooks, work->hit);
    clothi_free(&hooks, work);
}

/* The faces around each edge. */
static cloth_status clothi_inside_edges(clothi_inside *k) {
    clothi_edge_sort s;
    int              i;
    cloth_status     status = clothi_edge_sort_make(&k->hooks, k->nv, k->nf, k->faces, &s);
    if (status != CLOTH_OK) return status;
    for (i = 0; i < 3 * k->nf; i = clothi_edge_run(&s, 3 * k->nf, i)) k->edge_start[k->ne++] = i;
    k->edge_start[k->ne] = 3 * k->nf;
    for (i = 0; i < 3 * k->nf; i++) k->edge_face[i] = s.order[i] / 3;
    clothi_edge_sort_free(&k->hooks, &s);
    return CLOTH_OK;
}

/* The work of one mesh: topology, once. faces [nf x 3] in [0, nv), copied; hooks (may be NULL)
 * copied. *out: clothi_inside_free; NULL on failure.
 * contract: alloc about 140 bytes a face, the tree's 110 and 24 a vertex | cost O(nv + nf) */
CLOTHI_UNUSED static cloth_status clothi_inside_create(const cloth_hooks *hooks, int nv, int nf,
                                                       const int *faces, clothi_inside **out) {
    cloth_status   status = CLOTH_ERR_MEMORY;
    clothi_inside *k;
    const size_t   n = (size_t)nf;
    int            open;
    *out = NULL;
    k = (clothi_inside *)clothi_alloc(hooks, 1, sizeof *k);
    if (!k) goto done;
    if (hooks) k->hooks = *hooks;
    k->nv = nv;
    k->nf = nf;
    k->faces = (int *)clothi_alloc(hooks, 13 * n + 1u, sizeof(int));
    k->x = (double *)clothi_alloc(hooks, 9 * n + 3 * (size_t)nv, sizeof(double));
    k->closed = (unsigned char *)clothi_alloc(hooks, n, 3);
    if (!k->faces || !k->x || !k->closed) goto done;
    k->edge_face = k->faces + 3 * n;
    k->up = k->edge_face + 3 * n;
    k->size = k->up + n;
    k->asked = k->size + n;
    k->wind = k->asked + n;
    k->edge_start = k->wind + n;
    k->box = k->x + 3 * (size_t)nv;
    k->normal = k->box + 6 * n;
    k->flags = k->closed + n;
    k->before = k->flags + n;
    memcpy(k->faces, faces, 3 * n * sizeof(int));
    status = clothi_closed_faces(hooks, nv, nf, faces, k->closed, &open);
    if (status == CLOTH_OK) status = clothi_inside_edges(k);
done:
    if (status == CLOTH_OK) *out = k;
    else {
        clothi_inside_free(k);
        clothi_fail(hooks, status, "no memory to find what of %i faces is inside", nf);
    }
    return status;
}

/* --- cuts --- */

/* Boxes and normals of faces. */
static void clothi_inside_shape(int begin, int end, int worker, void *ctx) {
    clothi_inside *k = (clothi_inside *)ctx;
    int            f, a;
    (void)worker;
    for (f = begin; f < end; f++) {
        const double *p = k->x + 3 * k->faces[3 * f], *q = k->x + 3 * k->faces[3 * f + 1];
        const double *r = k->x + 3 * k->faces[3 * f + 2];
        double        d[3], e[3];
        for (a = 0; a < 3; a++) {
            const double lo = p[a] < q[a] ? p[a] : q[a], hi = p[a] < q[a] ? q[a] : p[a];
            k->box[6 * f + a] = r[a] < lo ? r[a] : lo;
            k->box[6 * f + 3 + a] = r[a] > hi ? r[a] : hi;
        }
        clothi_sub3(q, p, d);
        clothi_sub3(r, p, e);
        clothi_cross3(d, e, k->normal + 3 * f);
    }
}

/* The corners of g but `shared` strictly on one side of f's plane, by more than rounding: the
 * products' errors are below 16 ulp of (size of f)^2 times the distance. */
static int clothi_inside_apart(const clothi_inside *k, int f, int g, int shared) {
    const double *n = k->normal + 3 * f, *o = k->x + 3 * k->faces[3 * f], *box = k->box + 6 * f;
    const double  size = clothi_max(box[3] - box[0], clothi_max(box[4] - box[1], box[5] - box[2]));
    double        lo = HUGE_VAL, hi = -HUGE_VAL, far = 0, margin;
    int           i, a;
    for (i = 0; i < 3; i++) {
        const int v = k->faces[3 * g + i];
        double    d[3], s;
        if (v == shared) continue;
        clothi_sub3(k->x + 3 * v, o, d);
        s = clothi_dot3(n, d);
        lo = clothi_min(lo, s);
        hi = clothi_max(hi, s);
        for (a = 0; a < 3; a++) far = clothi_max(far, fabs(d[a]));
    }
    margin = 1e-14 * size * size * far;
    return lo > margin || hi < -margin;
}

/* Exact sign of the volume of four vertices. */
static int clothi_inside_side(const clothi_inside *k, int a, int b, int c, int d) {
    return clothi_orient3d(k->x + 3 * a, k->x + 3 * b, k->x + 3 * c, k->x + 3 * d);
}

/* 1 when b has corners on both sides of the plane of a. */
static int clothi_inside_astride(const clothi_inside *k, const int *a, const int *b) {
    int i, lo = 1, hi = -1;
    for (i = 0; i < 3; i++) {
        const int side = clothi_inside_side(k, a[0], a[1], a[2], b[i]);
        lo = side < lo ? side : lo;
        hi = side > hi ? side : hi;
    }
    return lo < 0 && hi > 0;
}

/* 1 when an edge of b that does not end in `shared` meets the face a without lying in its plane. */
static int clothi_inside_pierced(const clothi_inside *k, const int *a, const int *b, int shared) {
    int i, j;
    for (i = 0; i < 3; i++) {
        const int p = b[i], q = b[i == 2 ? 0 : i + 1];
        int       s, t, lo = 1, hi = -1;
        if (p == shared || q == shared) continue;
        s = clothi_inside_side(k, a[0], a[1], a[2], p);
        t = clothi_inside_side(k, a[0], a[1], a[2], q);
        if (s * t > 0 || (s == 0 && t == 0)) continue;
        for (j = 0; j < 3; j++) {
            const int turn = clothi_inside_side(k, p, q, a[j], a[j == 2 ? 0 : j + 1]);
            lo = turn < lo ? turn : lo;
            hi = turn > hi ? turn : hi;
        }
        if (lo >= 0 || hi <= 0) return 1;
    }
    return 0;
}

/* _CUT when the faces meet beyond the vertices that they share and each has corners on both sides
 * of the other, _TOUCHED when they meet otherwise, else 0. Two that share an edge meet only when
 * they lie on each other, flat: not counted. */
static int clothi_inside_meet(const clothi_inside *k, int f, int g) {
    const int *a = k->faces + 3 * f, *b = k->faces + 3 * g;
    int        i, j, n = 0, shared = -1;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (a[i] == b[j]) {
                n++;
                shared = a[i];
            }
    if (n > 1 || clothi_inside_apart(k, f, g, shared) || clothi_inside_apart(k, g, f, shared))
        return 0;
    if (!clothi_inside_pierced(k, a, b, shared) && !clothi_inside_pierced(k, b, a, shared))
        return 0;
    return clothi_inside_astride(k, a, b) && clothi_inside_astride(k, b, a)
               ? CLOTHI_INSIDE_CUT : CLOTHI_INSIDE_TOUCHED;
}

static void clothi_inside_pairs(int begin, int end, int worker, void *ctx) {
    clothi_inside *k = (clothi_inside *)ctx;
    int            i;
    (void)worker;
    for (i = begin; i < end; i++)
        k->hit[i] = (unsigned char)clothi_inside_meet(k, k->pairs.pair[2 * i],
                                                      k->pairs.pair[2 * i + 1]);
}

/* Marks the faces that are cut or touched. */
static cloth_status clothi_inside_cut(clothi_inside *k) {
    cloth_status status;
    int          i;
    if (k->tree.n != k->nf) status = clothi_bvh_build(&k->hooks, k->nf, k->box, &k->tree);
    else {
        clothi_bvh_refit(&k->hooks, &k->tree, k->box);
        status = CLOTH_OK;
    }
    if (status == CLOTH_OK) status = clothi_bvh_self_pairs(&k->hooks, &k->tree, &k->pairs);
    if (status != CLOTH_OK) return status;
    if ((size_t)k->pairs.count > k->hits) {
        clothi_free(&k->hooks, k->hit);
        k->hits = (size_t)k->pairs.count + (size_t)k->pairs.count / 4u;
        k->hit = (unsigned char *)clothi_alloc(&k->hooks, k->hits, 1);
        if (!k->hit) {
            k->hits = 0;
            return clothi_fail(&k->hooks, CLOTH_ERR_MEMORY, "no memory for %i pairs of faces",
                               k->pairs.count);
        }
    }
    clothi_for(&k->hooks, k->pairs.count, CLOTHI_INSIDE_GRAIN, clothi_inside_pairs, k);
    for (i = 0; i < k->pairs.count; i++)
        if (k->hit[i]) {
            k->flags[k->pairs.pair[2 * i]] |= k->hit[i];
            k->flags[k->pairs.pair[2 * i + 1]] |= k->hit[i];
        }
    return CLOTH_OK;
}

/* --- regions --- */

/* What face g adds to the winding number at p, beyond p along axis w. */
static int clothi_inside_cross(const clothi_inside *k, int g, int w, int forward,
                               const double *p) {
    const int *at = k->faces + 3 * g;
    double     depth = 0;
    int        turn;
    if (!k->closed[g]) return 0;
    turn = clothi_line_cross(k->x + 3 * at[0], k->x + 3 * at[1], k->x + 3 * at[2], w,
                             p[w == 2 ? 0 : w + 1], p[w == 0 ? 2 : w - 1], &depth);
    if (forward) return depth > p[w] ? turn : 0;
    return depth < p[w] ? -turn : 0;
}

/* The winding number just outside the centroid of face f; _UNKNOWN for a face without area. */
static int clothi_inside_outer(clothi_inside *k, int f) {
    const double *n = k->normal + 3 * f;
    double        p[3], ray[6];
    int           hit[CLOTHI_INSIDE_HITS], w, a, i, count, sum = 0, forward;
    w = fabs(n[0]) >= fabs(n[1]) ? 0 : 1;
    w = fabs(n[2]) > fabs(n[w]) ? 2 : w;
    if (!(fabs(n[w]) > 0)) return CLOTHI_INSIDE_UNKNOWN;
    forward = n[w] > 0;
    for (a = 0; a < 3; a++) {
        p[a] = k->x[3 * k->faces[3 * f] + a] / 3 + k->x[3 * k->faces[3 * f + 1] + a] / 3
               + k->x[3 * k->faces[3 * f + 2] + a] / 3;
        ray[a] = ray[3 + a] = p[a];
    }
    /* off the surface by more than rounding: what lies flat on f is behind */
    p[w] += (forward ? CLOTHI_INSIDE_OFF : -CLOTHI_INSIDE_OFF) * k->reach;
    ray[w] = forward ? p[w] : -CLOTHI_HUGE;
    ray[3 + w] = forward ? CLOTHI_HUGE : p[w];
    count = clothi_bvh_box_query(&k->tree, ray, CLOTHI_INSIDE_HITS, hit);
    k->rays++;
    if (count > CLOTHI_INSIDE_HITS)
        for (i = 0; i < k->nf; i++)
            sum += i != f ? clothi_inside_cross(k, i, w, forward, p) : 0;
    else
        for (i = 0; i < count; i++)
            sum += hit[i] != f ? clothi_inside_cross(k, hit[i], w, forward, p) : 0;
    return sum;
}

/* Regions of faces that meet no others: up[] leads to the first face of each. */
static void clothi_inside_flood(clothi_inside *k) {
    int e, f, i;
    for (f = 0; f < k->nf; f++) k->up[f] = f;
    for (e = 0; e < k->ne; e++) {
        int a = -1;
        for (i = k->edge_start[e]; i < k->edge_start[e + 1]; i++) {
            int b = k->edge_face[i];
            if (k->flags[b]) continue;
            b = clothi_root(k->up, b);
            if (a >= 0 && a != b) {
                k->up[a > b ? a : b] = a > b ? b : a;
                a = a > b ? b : a;
            } else a = b;
        }
    }
}

/* Marks the faces of regions that lie inside; touched faces are regions of one. Leaves _CUT or
 * _COVERED or 0 in flags. */
static void clothi_inside_regions(clothi_inside *k) {
    int f, r;
    k->rays = k->regions = 0;
    memset(k->size, 0, (size_t)k->nf * sizeof(int));
    memset(k->asked, 0, (size_t)k->nf * sizeof(int));
    for (f = 0; f < k->nf; f++) {
        r = k->up[f] = clothi_root(k->up, f);
        if (k->flags[f] & CLOTHI_INSIDE_CUT) continue;
        k->regions += k->size[r]++ == 0;
        k->wind[r] = CLOTHI_INSIDE_UNKNOWN;
    }
    for (f = 0; f < k->nf; f++) {
        int w;
        if (k->flags[f] & CLOTHI_INSIDE_CUT) continue;
        r = k->up[f];
        if (k->asked[r]++ % (k->size[r] / CLOTHI_INSIDE_RAYS + 1)) continue;
        w = clothi_inside_outer(k, f);
        if (w == CLOTHI_INSIDE_UNKNOWN) continue;
        if (k->wind[r] == CLOTHI_INSIDE_UNKNOWN) k->wind[r] = w;
        if (k->wind[r] != w) k->wind[r] = CLOTHI_INSIDE_MIXED;
    }
    for (f = 0; f < k->nf; f++) {
        int w = k->wind[k->up[f]];
        if (k->flags[f] & CLOTHI_INSIDE_CUT) {
            k->flags[f] = CLOTHI_INSIDE_CUT;
            continue;
        }
        if (w == CLOTHI_INSIDE_MIXED) w = clothi_inside_outer(k, f);
        k->flags[f] = w >= 1 ? CLOTHI_INSIDE_COVERED : 0;
    }
}

/* --- a pose --- */

/* k->flags of pose x [nv x 3]; nothing is done again for the pose of the last call. */
static cloth_status clothi_inside_flags(clothi_inside *k, const double *x) {
    const size_t n = 3 * (size_t)k->nv;
    cloth_status status;
    ptrdiff_t    bad;
    if (k->known && memcmp(k->x, x, n * sizeof(double)) == 0) return CLOTH_OK;
    bad = clothi_find_nonfinite(x, n);
    if (bad >= 0)
        return clothi_fail(&k->hooks, CLOTH_ERR_NONFINITE, "x[%i] of an obstacle = %g", (int)bad,
                           x[bad]);
    k->known = 0;
    k->reach = clothi_max_abs(x, 3 * k->nv);
    memcpy(k->x, x, n * sizeof(double));
    memset(k->flags, 0, (size_t)k->nf);
    clothi_for(&k->hooks, k->nf, CLOTHI_INSIDE_GRAIN, clothi_inside_shape, k);
    status = clothi_inside_cut(k);
    if (status != CLOTH_OK) return status;
    clothi_inside_flood(k);
    clothi_inside_regions(k);
    k->known = 1;
    return CLOTH_OK;
}

/* exempt [nf] = 1 for the faces that are no obstacle in pose x [nv x 3], else 0; *count of them,
 * may be NULL. CLOTH_OK, CLOTH_ERR_NONFINITE: x, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY; exempt is
 * as before then.
 * contract: alloc only where a pose needs more than those before | a function of x alone |
 *   hooks.parallel, same bits for any workers */
CLOTHI_UNUSED static cloth_status clothi_inside_find(clothi_inside *k, const double *x,
                                                     unsigned char *exempt, int *count) {
    cloth_status status = clothi_inside_flags(k, x);
    int          f, n = 0;
    if (status != CLOTH_OK) return status;
    for (f = 0; f < k->nf; f++) {
        exempt[f] = k->flags[f] != 0;
        n += exempt[f];
    }
    if (count) *count = n;
    return CLOTH_OK;
}

/* The same for a step from pose xa to pose xb: exempt in either. The flags of xa are there when
 * the last call ended with that pose: one pose's work a step. */
CLOTHI_UNUSED static cloth_status clothi_inside_sweep(clothi_inside *k, const double *xa,
                                                      const double *xb, unsigned char *exempt,
                                                      int *count) {
    cloth_status status = clothi_inside_flags(k, xa);
    int          f, n = 0;
    if (status != CLOTH_OK) return status;
    memcpy(k->before, k->flags, (size_t)k->nf);
    status = clothi_inside_flags(k, xb);
    if (status != CLOTH_OK) return status;
    for (f = 0; f < k->nf; f++) {
        exempt[f] = k->flags[f] != 0 || k->before[f] != 0;
        n += exempt[f];
    }
    if (count) *count = n;
    return CLOTH_OK;
}

/* exempt of faces [nf] handed on: an item is exempt, out [n], when all its faces are. items
 * [nf x 3]: the faces' vertices, or their edges (cloth_topology.face_edges). */
CLOTHI_UNUSED static void clothi_inside_spread(int nf, const int *items,
                                               const unsigned char *exempt, int n,
                                               unsigned char *out) {
    int i;
    memset(out, 0, (size_t)n);
    for (i = 0; i < 3 * nf; i++)
        if (exempt[i / 3]) out[items[i]] = 1;
    for (i = 0; i < 3 * nf; i++)
        if (!exempt[i / 3]) out[items[i]] = 0;
}

/* covered [nf] = 1 for the faces that lie inside and are not cut, else 0. */
static cloth_status clothi_inside_covered(const cloth_hooks *hooks, int nv, const double *x,
                                          int nf, const int *faces, unsigned char *covered) {
    clothi_inside *k = NULL;
    cloth_status   status = clothi_inside_create(hooks, nv, nf, faces, &k);
    int            f;
    if (status == CLOTH_OK) status = clothi_inside_flags(k, x);
    for (f = 0; f < nf && status == CLOTH_OK; f++)
        covered[f] = k->flags[f] == CLOTHI_INSIDE_COVERED;
    clothi_inside_free(k);
    return status;
}

/* ===== [8.1] SCENE =========================================================================== */

/* ===== [8.2] PROXIMITY AND FRICTION ========================================================== */

/* ===== [8.3] IMPACT ZONES ==================================================================== */

/* ===== [8.4] THE CONTACT IN THE STEP ========================================================= */

/* ===== [8.5] QUERIES ========================================================================= */

/* ===== [9.1] CHANGES =========================================================================
 *
 * 0.1.0  first version. MIT licence: the text in LICENSE holds for this file.
 */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
