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
 *   read before the first line of your own
 *     [1.1] QUICK START
 *     [1.2] WHAT IS GUARANTEED, WHAT IT COSTS, WHAT EACH PARAMETER DOES
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
 *     [8.5] QUERIES                          [8.6] UNTANGLING
 *     [9.1] CHANGES
 */

/* ===== [1.1] QUICK START =====================================================================
 *
 * A sheet falls on a sphere and comes to rest (examples/12_drape.c, without what draws it).
 *
 * ---- 12_drape.c ----
 *     #define CLOTHSIM_IMPLEMENTATION
 *     #include "clothsim_collide.h"
 *     #include <stdio.h>
 *
 *     int main(void) {
 *         double              center[3] = {0.5, -0.4, 0.5}, gap = 0;          // metres
 *         int                 frame, pairs = 0;
 *         cloth_mesh         *sheet = NULL;
 *         cloth_model        *model = NULL;
 *         cloth_sim          *sim = NULL;
 *         cloth_collide      *contact = NULL;
 *         cloth_desc          desc = cloth_desc_default();
 *         cloth_obstacle_desc ball = cloth_obstacle_desc_default();
 *         cloth_obstacle      id;
 *
 *         if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 32, 32, 1.0, 1.0, &sheet)) return 1;
 *         desc.nv = sheet->nv, desc.x_rest = sheet->x;
 *         desc.nf = sheet->nf, desc.faces = sheet->faces;
 *         desc.contact = CLOTH_CONTACT_SELF;                                  // and obstacles
 *         if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
 *         if (cloth_collide_create(sim, NULL, &contact)) return 1;
 *         ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = 0.3;
 *         if (cloth_collide_add(contact, &ball, &id)) return 1;
 *         for (frame = 0; frame < 90; frame++) {
 *             if (cloth_step(sim, 1.0 / 60, NULL)) return 1;                  // seconds
 *         }
 *         if (cloth_collide_gap(contact, 0.01, &gap)) return 1;
 *         if (cloth_collide_intersections(contact, 0, NULL, &pairs)) return 1;
 *         printf("after %.3f s a smallest gap over 0.5 mm: %s; pairs that intersect: %d\n",
 *                cloth_sim_state(sim)->t, gap > 0.5e-3 ? "yes" : "no", pairs);
 *         cloth_collide_destroy(contact), cloth_sim_destroy(sim);
 *         cloth_model_destroy(model), cloth_mesh_destroy(NULL, sheet);
 *         return 0;
 *     }
 * ---- end ----
 *
 * More: 13_fold.c several cloths, 14_ring.c a mesh obstacle, 15_pinch.c what to do when a step
 * fails and when cloth begins inside of something, 16_walk.c a garment on a body that moves.
 */

/* ===== [1.2] WHAT IS GUARANTEED, WHAT IT COSTS, WHAT EACH PARAMETER DOES =====================
 *
 * GUARANTEED. A step that returns CLOTH_OK ends in a state in which no pair of faces intersects
 * that did not intersect before: cloth with cloth under CLOTH_CONTACT_SELF, cloth with obstacles
 * always. A step that cannot keep this returns a status, with outcome and pairs
 * (cloth_collide_failed), and the state is bit for bit as before. The promise is detection's [4.1],
 * which looks at the true motion; potential, friction and zones only decide where the cloth goes.
 * It holds over several steps as each holds: what did not intersect at the start of one does not at
 * its end.
 *
 * EXEMPT FROM IT
 *   - pairs that intersect at the start, where they are let in (CLOTH_INITIAL_EXEMPT), until they
 *     have parted: report.exempt_pairs. Their corners and edges pass each other, which are those of
 *     the faces around them too: the line of intersection wanders to pairs beside them, which are
 *     exempt then as well. cloth_collide_untangle() pushes them apart
 *   - faces of a self_penetrating obstacle that lie inside that obstacle, or look at each other
 *     nearer than cloth has room for, for the step: report.exempt_faces [7.2]. Cloth that is caught
 *     there may be passed by them; the rest of the obstacle holds it. What was let in crosses those
 *     faces when they are an obstacle again; its crossings are exempt, wander to the faces beside
 *     them and are led out at desc.push_out [7.2]: cloth that is inside may pass the obstacle's
 *     surface on its way out, and a limb that cloth crosses is exempt too, from there outwards. A
 *     body whose hands and thighs sink far into it lets in hundreds of pairs
 *     (tests/stability/garments.c); one that barely touches itself none
 *   - parts and obstacles whose category and mask exclude each other
 *   - distance grids (CLOTH_OBSTACLE_GRID): a potential alone, no detection. Vertices may sink in
 *     under load, faces and edges cut through what is sharper than the cloth's mesh; cloth may
 *     begin inside and is led out [8.2]
 *   - a teleported obstacle: the jump itself is not looked at, only where it ends
 *   - the path between the ends of a step is looked at as straight lines: an obstacle that turns
 *     far in one step cuts its corners, by 1 - cos(angle/2) of its radius: step shorter
 *   - leapfrog: contact looks ONCE a step, over the straight path from its start to its end, at
 *     whatever number of substeps. Potential and friction do not act within it. Choose h for at
 *     most 4 substeps (report.substeps): with more, cloth in contact gains energy [8.3]
 *   - statics: refused for a sim that has contact
 *
 * NOT PROMISED. That a step succeeds: cloth that is pinched below its separation has no answer.
 * That a slide begins at desc.tolerance's default: a contact that sticks is some 100 times stiffer
 * than inertia, so that Newton's first update of a sheet that ought to slip is shorter than 1e-4 m
 * and ends the search. Way of a sheet on a plane of 30 degrees in 1 s over what it should be:
 *     tolerance, slip m    mu = 0.99 tan a    0.95    0.90    0.80    0.50
 *     1e-4, 2e-5                      0.09    0.27    0.51    0.76    0.96
 *     1e-5, 2e-5                      0.09    0.75    0.96    0.94    1.00
 *     1e-6, 2e-5                      0.42    0.97    0.97    0.98    1.00
 *     1e-6, 2e-4                      1.23    1.02    1.00    0.99    1.00
 *     1e-7, 2e-5                      1.00    0.97    0.97    0.98    1.00
 * What sticks stays at any tolerance. Where the beginning of a slide matters, take 1e-6.
 * E_col and friction are in the frame (normal, weights, range) of the START of the substep: normals
 * that turn within it, and what came into range during it, are felt one substep late; the normal
 * force in Coulomb's law is that of the substep before [8.2]. Energy: the zones remove the speed of
 * approach, without rebound, whatever the cloth would do.
 *
 * COSTS, on one core of an AMD EPYC at gcc -O2, in ms of CPU a step of 1/60 s:
 *   sheet 32 x 32 on a sphere (12_drape.c)                          about 30, mean of 90 steps
 *   T-shirt of 2832 faces on a walking body of 5344 (16_walk.c)     about 60, mean of 60 steps
 *   skirt on a walking body of 27 000 faces (tests/bench/bench_contact.c, -march=native): 57,
 *   of which contact 45 %; T-shirt there 480, 26 %; sheet 32 x 32 on a sphere 15 %. Contact here is
 *   pairs, detection and zones; the potential's part of Newton's iterations is Newton's
 *   sheet 24 x 24 on a sphere, obstacles only, contact's part of 8 to 18 ms: the sphere as such
 *   0.53, as a mesh of 40 rings 7.5, as a grid 0.28 (FULL=1 tests/test_grid_contact.c)
 * It grows with pairs in range rather than with faces: layers that lie on each other are dear, and
 * a cloth folded many times can cost ten times the same cloth spread out. Without desc.contact
 * nothing is called and nothing allocated.
 *
 * EACH PARAMETER              what more of it does to the result | to the cost and the promise
 *   thickness    t: layers rest t/2 apart and feel each other from t on | more pairs, which
 *                is what costs. A fifth of an edge's length is a good size; much over an
 *                edge, faces that are neighbours but one are pairs. Too thin: detection's
 *                separation t/4 nears rounding, pushes get stiffer. The pinch at which a step fails
 *                is t/4 wide on either side
 *   stiffness    0 follows the weight. More: closer to t, less sinking under load | worse
 *                condition, more Newton iterations. The promise does not depend on it
 *   relaxation   slower rise after an impact, t/(4 relaxation) at most, so less rebound | damping
 *                is implicit, about free
 *   friction     Coulomb's mu, cloth on cloth; each obstacle has its own | convex, but 0 is the
 *                fastest: its terms are the last that Newton settles
 *   slip         give before a contact that sticks holds fully | smaller: stiffer, more iterations;
 *                larger: visible give, though no creep
 *   max_push     how far, root mean square, a zone may be moved from where the step wanted it
 *                before the step fails instead | smaller: earlier failures, shorter steps;
 *                larger: leaps are let through, still without intersections
 *   push_out     cloth leaves obstacles that penetrate themselves, at this speed; one of two parts
 *                that meet holds it. 0: both let go, and what got in stays until it comes out of
 *                itself | with the default a skirt is free 0.15 s after each pinch, at 0.7 of the
 *                time a step; a limb that cloth crosses holds none. Other obstacles: no difference
 *   max_passes   rounds of detection and zones | fewer: hard steps fail sooner and cheaper
 *   initial      REFUSE names what intersects before the first step, EXEMPT counts it and lets it
 *                part, of itself or by cloth_collide_untangle | exempt pairs are outside of the
 *                promise until they do
 *   halvings     of cloth_collide_step: what fails is tried over h/2, h/4, .. ; the fraction
 *                reached is reported and time has moved by it | each try costs a step
 */

#ifndef CLOTHSIM_COLLIDE_H
#define CLOTHSIM_COLLIDE_H

#include "clothsim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.1] CONTINUOUS DETECTION ============================================================
 *
 * Four points move on straight lines from xa [4x3] at t = 0 to xb [4x3] at t = 1 (m). vf: a vertex,
 * then the corners of a face. ee: both ends of one edge, then both ends of the other.
 *
 * Returns 1 and *toi in [0,1] when the two come within min_sep (m; below 0 counts as 0) of each
 * other, else 0 (*toi is then 1). toi may be NULL.
 *   - Never 0 for a true contact: coplanar motion, parallel edges, edges and faces of no length or
 *     area, contact at the start or at the end, any scale.
 *   - At every time before *toi the distance is greater than min_sep. At *toi it is at most
 *     min_sep + 1e-6 min_sep + 3e-14 size, size the largest difference between the two; only
 *     where a sliver turns far, after 256 steps, can it be more.
 *   - Within min_sep at the start: 1 and 0, also when the two part.
 *   - 1 is a false alarm where the least distance is between min_sep and that. With min_sep = 0 a
 *     second look with twice the digits leaves those below 1e-28 size.
 * A number that is not finite: 1 and 0. Cost: 0.05 to 0.3 us without contact, 1 to 2 us with; with
 * min_sep = 0, touching without crossing, on a side, say, or along a line, up to 100 us. */
CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi);
CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi);

/* ===== [2.2] QUADRATIC PROGRAM =============================================================== */

/* min 1/2 sum_i (x_i - x0_i)^2 / minv_i   s.t.   G x <= h,   G sparse by rows              [6.1] */
typedef struct cloth_qp {
    int n, m;                   /* unknowns >= 1, constraints >= 0                             */
    const double *minv;         /* [n]      1/kg, >= 0; 0: x_i stays at x0_i                   */
    const double *x0;           /* [n]      m                                                  */
    const int    *row;          /* [m+1]    start of each row in col and val; row[0] = 0       */
    const int    *col;          /* [row[m]] a column named twice in a row is summed            */
    const double *val;          /* [row[m]]                                                    */
    const double *h;            /* [m]      m                                                  */
} cloth_qp;

typedef enum cloth_qp_outcome {
    CLOTH_QP_NONE = 0,          /* the call failed: see its status                             */
    CLOTH_QP_SOLVED = 1,
    CLOTH_QP_INFEASIBLE = 2,    /* no x satisfies the rows: lambda proves it                   */
    CLOTH_QP_MAX_ITERATIONS = 3 /* neither; x and lambda are the last iterate                  */
} cloth_qp_outcome;

/* Memory that solves share: opaque. One solve at a time. */
typedef struct cloth_qp_work cloth_qp_work;

#define CLOTH_DEFAULT_QP_TOLERANCE 1e-9

typedef struct cloth_qp_options {
    uint32_t       cookie;      /* set by cloth_qp_options_default()                           */
    cloth_hooks    hooks;       /* allocator (without work), log, cancel: asked per iteration  */
    double         tolerance;   /* relative KKT residual, > 0; default 1e-9                    */
    int            max_iterations;  /* active sets tried, >= 0; default 0: 100 + 10 m          */
    const double  *guess;       /* [m] multipliers of a similar problem, borrowed; default     */
                                /* NULL. Rows with guess > 0 are tried first                   */
    cloth_qp_work *work;        /* borrowed; default NULL: memory is taken and given back      */
} cloth_qp_options;

typedef struct cloth_qp_report {
    cloth_qp_outcome outcome;
    int    iterations;          /* active sets tried                                           */
    int    factorizations;      /* of the matrix of an active set, from its first row          */
    int    refactorizations;    /* of a part of it, when a row left                            */
    int    active;              /* rows with lambda > 0                                        */
    int    dropped;             /* rows without a free unknown, and copies of other rows       */
    int    precise;             /* 1: finished in twice the digits, the rows being almost      */
                                /* dependent; 0: plain doubles were enough                     */
    double primal;              /* max (g x - h)+ / s, s = |h| + sum |g| r; r_j the largest of */
                                /* |x_j|, |x0_j| and, up to max |x|, minv_j sum_i |G_ij| l_i   */
    double dual;                /* max |x - x0 + minv G'lambda| / max(|x|, |x0|, minv |G'||l|) */
    double complementarity;     /* max |h - g x| / s over rows with lambda > 0                 */
    double residual;            /* the largest of the three; <= tolerance when solved          */
    double objective;           /* kg m^2                                                      */
    double certificate;         /* lambda.(h - G_fixed x0_fixed) m; < 0 when infeasible else 0 */
} cloth_qp_report;

CLOTH_API cloth_qp_options cloth_qp_options_default(void);

/* Solves the QP.                                                                           [6.1]
 * in   qp       as above; every number finite
 * in   opt      NULL: defaults
 * out  x        [n] m, may be NULL. Infeasible: x0
 * out  lambda   [m] >= 0, kg m per unit of the row; may be NULL.  x = x0 - minv o (G' lambda).
 *               Infeasible: a certificate: max 1, |G_free' lambda| <= 1e-10 max|G| and
 *               lambda.(h - G_fixed x0_fixed) < 0 by more than rounding, so that a positive sum
 *               of the rows reads 0 <= something negative
 * out  rep      may be NULL
 * returns CLOTH_OK, whatever the outcome; CLOTH_ERR_ARGUMENT, _NONFINITE: a sentence names the
 *   field and its value; _UNINIT: options without cookie; _MEMORY; _CAPACITY: the matrix of the
 *   rows would have more than 2^31 entries; _CANCELLED. x and lambda are as before then.
 * x is unique. lambda is unique only where the active rows are independent.
 * The same input gives the same bits. A guess can change them only where the optimum has several
 * active sets (dependent rows, multipliers that are zero at the optimum) or the outcome is not
 * SOLVED; work never does.
 * contract: alloc none with work of a similar solve behind it, else O(size) | cost one row: closed
 *   form; else about 5 factorizations of the active rows ordered to a small profile: O(m p^2), p
 *   the mean profile | threads: distinct work */
CLOTH_API cloth_status cloth_qp_solve(const cloth_qp *qp, const cloth_qp_options *opt, double *x,
                                      double *lambda, cloth_qp_report *rep);

/* out  *out     owned: cloth_qp_work_destroy, NULL allowed; NULL on failure. hooks: copied; NULL:
 *               malloc.  Keeps the memory of the largest solve.  returns CLOTH_OK, _ARGUMENT,
 *               _MEMORY */
CLOTH_API cloth_status cloth_qp_work_create(const cloth_hooks *hooks, cloth_qp_work **out);
CLOTH_API void   cloth_qp_work_destroy(cloth_qp_work *work);
CLOTH_API size_t cloth_qp_work_bytes(const cloth_qp_work *work);

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* Which faces of a mesh intersect each other at given positions, decided exactly.          [5.2]
 * Two faces intersect when, as closed triangles, they have a point in common that is not on a
 * vertex or an edge that both name: touching counts, neighbours along an edge count only when
 * folded onto each other in one plane, faces with the same three vertices never. Vertices at one
 * place with two numbers are two: a mesh that is not welded touches itself all along its seams.
 * in   x          [nv x 3] m, finite
 * in   faces      [nf x 3], no corner twice; any set of triangles, also without area
 * in   max_pairs  that pairs has room for; 0 with pairs NULL: count only
 * out  pairs      [max_pairs x 2] faces i < j in increasing order: the first min(*count, max_pairs)
 * out  count      how many there are in all, may be NULL; 0 on failure
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT; CLOTH_ERR_MESH: an index out of range or a corner twice;
 *   CLOTH_ERR_NONFINITE; CLOTH_ERR_MEMORY; CLOTH_ERR_CAPACITY: more than 2^30 pairs. pairs is as
 *   before on failure.
 * contract: alloc scratch | cost O(nf log nf + pairs near each other), 2 us a face | uses the
 *   parallel hook | same answer for any worker count */
CLOTH_API cloth_status cloth_intersections(const cloth_hooks *hooks, int nv, const double *x,
                                           int nf, const int *faces, int max_pairs, int *pairs,
                                           int *count);

/* ===== [2.4] DISTANCE GRID ===================================================================
 *
 * Signed distance to a closed mesh, sampled on a regular grid, for queries and for soft contact
 * (CLOTH_OBSTACLE_GRID): no promise of section [2.5] rests on it.             section [7.1] */

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
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: NULL, n below 2, cell not above 0; CLOTH_ERR_NONFINITE: x
 * contract: alloc none | cost O(1), 8 loads | threads: any */
CLOTH_API cloth_status cloth_grid_sample(const cloth_grid *grid, const double x[3],
                                         double *distance, double gradient[3]);

/* ===== [2.5] CONTACT ========================================================================= */

typedef enum cloth_initial {                /* pairs that intersect before the first step      */
    CLOTH_INITIAL_REFUSE = 1,               /* (default) named and refused                     */
    CLOTH_INITIAL_EXEMPT = 2,               /* listed, counted, and free to pass until they part */
    CLOTH_INITIAL_FORCE_INT = 0x7fffffff
} cloth_initial;

/* Whom a part may touch: two things collide when each one's category is in the other's mask. */
typedef struct cloth_collide_part {
    int      self;                          /* collides with itself and with other parts that
                                               do; read only under CLOTH_CONTACT_SELF          */
    uint32_t category, mask;                /* bits                                            */
} cloth_collide_part;

/* Distances nest: separation t/4 < gap t/2 < range t. Start from cloth_collide_desc_default(). */
typedef struct cloth_collide_desc {
    uint32_t      cookie;
    double        thickness;                /* m, t > 0; default 2e-3. Not the material's      */
    double        stiffness;                /* Pa/m of the proximity potential; 0 (default): a
                                               sheet under 30 times its weight rests at t/2    */
    double        relaxation;               /* s, of its damping; default 0.02                 */
    double        friction;                 /* cloth on cloth, default 0.3                     */
    double        slip;                     /* m, give of an anchor before it slips; 2e-5      */
    double        max_push;                 /* m, root mean square of a zone's correction over
                                               which the step fails; default 0.1               */
    int           max_passes;               /* rounds of detection, default 40                 */
    double        push_out;                 /* m/s at which cloth is led out of obstacles that
                                               are self_penetrating; default 0.2; 0: not [7.2] */
    cloth_initial initial;
    int           nparts;                   /* 0: every part collides with everything          */
    const cloth_collide_part *parts;        /* [nparts], one for each part of the model; copied */
} cloth_collide_desc;

typedef enum cloth_obstacle_kind {
    CLOTH_OBSTACLE_MESH    = 1,             /* triangles, open or closed                       */
    CLOTH_OBSTACLE_SPHERE  = 2,             /* x [3] centre                                    */
    CLOTH_OBSTACLE_CAPSULE = 3,             /* x [2 x 3] ends of the axis                      */
    CLOTH_OBSTACLE_PLANE   = 4,             /* x [3] a point of it; all behind it is solid     */
    CLOTH_OBSTACLE_BOX     = 5,             /* x [8 x 3] corners, cloth_obstacle_box()         */
    CLOTH_OBSTACLE_GRID    = 6,             /* x [3] where (0, 0, 0) of the grid's space is. A
                                               potential alone, outside of the promise   [8.2] */
    CLOTH_OBSTACLE_FORCE_INT = 0x7fffffff
} cloth_obstacle_kind;

typedef struct cloth_obstacle_desc {        /* cloth_obstacle_desc_default()                   */
    uint32_t            cookie;
    cloth_obstacle_kind kind;
    int                 nv, nf;             /* MESH only                                       */
    const double       *x;                  /* [nv x 3] m, or as the kind says; copied         */
    const int          *faces;              /* [nf x 3], MESH only; copied                     */
    double              radius;             /* m, SPHERE and CAPSULE > 0; GRID >= 0: the
                                               surface is that much farther out                */
    double              normal[3];          /* PLANE: out of the solid; any length but 0       */
    double              friction;           /* default 0.3                                     */
    uint32_t            category, mask;     /* default 1 and all                               */
    int                 self_penetrating;   /* MESH, closed: faces inside itself are found at
                                               each step and exempt in it                      */
    const cloth_grid   *grid;               /* GRID; borrowed, unchanged while the obstacle is
                                               there; its band over radius + thickness         */
} cloth_obstacle_desc;

typedef struct cloth_collide cloth_collide; /* belongs to one sim                              */

typedef struct cloth_obstacle {             /* slot and generation, 0: none                    */
    uint32_t id;
} cloth_obstacle;

typedef struct cloth_touch {                /* one contact of the last accepted step           */
    int            edge_edge;               /* else a vertex and a face                        */
    int            n;                       /* cloth vertices of it, 1 to 4                    */
    int            vertex[4];
    double         weight[4];               /* of each                                         */
    cloth_obstacle obstacle;                /* 0: cloth on cloth                               */
    double         normal[3];               /* towards the weights > 0                         */
    double         gap;                     /* m, at the start of the last substep             */
    double         force;                   /* N, along the normal: of E_col, or impulse / h   */
    double         impulse;                 /* N s, of the impact zones alone                  */
    int            sliding;                 /* friction is at its limit                        */
} cloth_touch;

typedef struct cloth_collide_report {       /* of the last step                                */
    int    candidates;                      /* pairs that detection looked at                  */
    int    impacts;                         /* pairs that it found                             */
    int    passes, zones, rigid_zones;
    int    rows, largest_zone;              /* rows of the largest zone                        */
    int    qp_iterations;
    int    touches;                         /* pairs in the proximity potential                */
    int    exempt_faces;                    /* of obstacles inside themselves, near cloth      */
    int    exempt_pairs;                    /* that intersected and have not parted            */
    double push;                            /* m, root mean square of the worst zone           */
    double fraction;                        /* of the step that was taken: cloth_collide_step  */
    double ms_begin, ms_detect, ms_zones;   /* 0 without a clock                               */
} cloth_collide_report;

typedef struct cloth_collide_pair {
    int            faces;                   /* faces a and b, which intersect; else            */
    int            edge_edge, a, b;         /* edges a and b, or vertex a and face b; what is of
                                               an obstacle counts in its mesh (BOX too), 0 of
                                               others. Edges: by lower end, then by the other  */
    cloth_obstacle obstacle;
    int            reversed;                /* vertex or edge a is the obstacle's, b the cloth's */
} cloth_collide_pair;

CLOTH_API cloth_collide_desc  cloth_collide_desc_default(void);
CLOTH_API cloth_obstacle_desc cloth_obstacle_desc_default(void);

/* Corners x [8 x 3] of a box: center and half edges m; R [3 x 3] turns it (NULL: not). */
CLOTH_API void cloth_obstacle_box(const double center[3], const double half[3], const double *R,
                                  double *x);

/* Gives a sim its contact; needs desc.contact CLOTH_CONTACT_OBSTACLES or _SELF in its model.
 * in   desc   NULL: the defaults; copied
 * out  *out   owned: cloth_collide_destroy, before the sim
 * returns CLOTH_OK; _UNINIT; _ARGUMENT, _NONFINITE: field and value logged; _UNSUPPORTED: the
 *   model's rung is CLOTH_CONTACT_NONE, or it has ties; _MESH: the cloth intersects itself under
 *   CLOTH_INITIAL_REFUSE (the first pair is logged); _MEMORY */
CLOTH_API cloth_status cloth_collide_create(cloth_sim *sim, const cloth_collide_desc *desc,
                                            cloth_collide **out);
CLOTH_API void         cloth_collide_destroy(cloth_collide *c);             /* NULL allowed    */

/* An obstacle, at rest where desc->x says. Errors as create; _MESH also: a broken mesh. After add
 * and remove the queries know of no last step, and cloth_sim_restore takes only snapshots made
 * with these obstacles, else _FORMAT. What sticks to others goes on to stick. On failure, also of
 * the next three, everything is as before; a stale or unknown id: CLOTH_ERR_HANDLE. A grid is read
 * whole once; _UNSUPPORTED: one under leapfrog, which has no potential. */
CLOTH_API cloth_status cloth_collide_add(cloth_collide *c, const cloth_obstacle_desc *desc,
                                         cloth_obstacle *id);
CLOTH_API cloth_status cloth_collide_remove(cloth_collide *c, cloth_obstacle id);
/* x_end, shaped as desc->x: reached at the end of the next accepted step, swept on straight paths
 * from the pose of the last accepted state. */
CLOTH_API cloth_status cloth_collide_move(cloth_collide *c, cloth_obstacle id,
                                          const double *x_end);
/* There at once; what intersects cloth then is refused or exempt as at create. */
CLOTH_API cloth_status cloth_collide_teleport(cloth_collide *c, cloth_obstacle id,
                                              const double *x);

/* cloth_step, and where contact cannot be resolved or Newton stalls a shorter one: h/2, h/4, ..
 * h/2^halvings, pins and obstacles going that part of their way. cloth_collide_last() tells the
 * fraction reached. */
CLOTH_API cloth_status cloth_collide_step(cloth_collide *c, double h, int halvings,
                                          cloth_report *report);

/* --- queries, of the last accepted step unless said; after a step that failed they know of none.
 * CLOTH_ERR_ARGUMENT: NULL, max below 0, range not above 0; _NONFINITE: range, x; logged --- */

CLOTH_API cloth_collide_report cloth_collide_last(const cloth_collide *c);
/* The first `max` touches; *count: all of them. */
CLOTH_API cloth_status cloth_collide_touches(const cloth_collide *c, int max, cloth_touch *touch,
                                             int *count);
/* f [nv x 3] N: all that contact did to each vertex in the last substep: E_col and friction as the
 * minimiser felt them, and the impulses of the zones over h. Over an implicit substep the sum is
 * M (v - v^n)/h less the other forces [8.4]. */
CLOTH_API cloth_status cloth_collide_forces(const cloth_collide *c, double *f);
/* f [nv x 3] N: the part of it that is friction; the rest is along the normals. */
CLOTH_API cloth_status cloth_collide_friction(const cloth_collide *c, double *f);
/* Smallest distance now, m, of pairs nearer than `range`; range when there is none. With a grid it
 * is that of vertices, below 0 inside. */
CLOTH_API cloth_status cloth_collide_gap(cloth_collide *c, double range, double *gap);
/* Pairs of faces that intersect now: cloth with cloth (SELF) and with obstacles, exempt ones
 * included. Faces of obstacles count on from nf in the order of their slots. pairs [max x 2] */
CLOTH_API cloth_status cloth_collide_intersections(cloth_collide *c, int max, int *pairs,
                                                   int *count);
/* The exempt pairs of the accepted state, report.exempt_pairs of them: of faces that intersect, and
 * of vertices, edges and faces inside a sphere, a capsule or a plane. */
CLOTH_API cloth_status cloth_collide_exempt(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count);
/* What could not be resolved in the last step that failed. */
CLOTH_API cloth_status cloth_collide_failed(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count);

typedef struct cloth_untangle_report {
    int    before, after;                   /* pairs that intersect: of faces, or of a feature
                                               with a sphere, a capsule, a plane               */
    int    wandered;                        /* of `after`: beside pairs of before, not of them */
    int    vertices;                        /* cloth's on the wrong side, before               */
    double depth;                           /* m, of the deepest, before                       */
    double moved;                           /* m, largest motion of a vertex                   */
    int    tries;                           /* each after the first: half of the motion        */
    int    stalled;                         /* nothing helped: nothing was moved               */
    int    held;                            /* stalled, and all vertices of `pair` are pinned  */
    cloth_collide_pair pair;                /* stalled: the one to look at                     */
} cloth_untangle_report;

/* Pushes pairs that intersect and are exempt (CLOTH_INITIAL_EXEMPT) apart, part of the way a call:
 * call it until report.after is 0, by itself or between steps, which give the cloth its shape
 * back.                                                                                    [8.6]
 * Cloth leaves closed obstacles by the nearest point and goes back through other surfaces towards
 * its larger part; where neither says what is wrong, the line of intersection is made shorter.
 *   - only x of vertices that are not pinned changes, v stays; max_move m at most a vertex (0: 5 t)
 *     and what it takes to keep others clear
 *   - pairs that are clear of the tangle stay clear, on their whole path, as in a step. Where a
 *     line of intersection has faces to cross it wanders over them: a pair may be new that is
 *     beside one that was, a vertex shared on either side, or had a vertex inside of the closed
 *     obstacle (report.wandered); none elsewhere
 *   - pairs that have parted are exempt no more; those left are
 *   - anchors of friction, touches and BDF2's history are forgotten
 * out  report   may be NULL
 * returns CLOTH_OK: fewer or shallower, or none are left (after 0); CLOTH_ERR_STEP: no motion
 *   that was tried helps. Logged with the pair to look at, all listed by cloth_collide_failed();
 *   CLOTH_ERR_ARGUMENT, _NONFINITE: max_move or x, logged; _MEMORY; _CAPACITY; _CANCELLED. The
 *   state is as before on failure.
 * contract: alloc scratch, 150 bytes a vertex of the world and 100 a cut, freed | cost: two looks
 *   for intersections, detection and zones as of a step for each try, at most 6; cuts x wrong
 *   vertices; pairs^2 | same bits for any workers */
CLOTH_API cloth_status cloth_collide_untangle(cloth_collide *c, double max_move,
                                              cloth_untangle_report *report);

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_COLLIDE_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_COLLIDE_IMPLEMENTED)
#define CLOTHSIM_COLLIDE_IMPLEMENTED

#include "clothsim.h"       /* its implementation, where only the interface has been seen so far */

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

/* ===== [3.2] DISTANCES =======================================================================
 *
 * Vertex and face, edge and edge are one problem: how near does a flat polygon of differences
 * r_k come to the origin?
 *
 *     vertex p, face a b c      r = p - a, p - b, p - c                          a triangle
 *     edges a0 a1, b0 b1        r = a0 - b0, a1 - b0, a1 - b1, a0 - b1           a parallelogram
 *
 * In differences the error is relative to the size of the pair, not to its coordinates. The
 * nearest point is the foot of the perpendicular when that is inside, else it is on a side of the
 * polygon. All candidates are points of the polygon and the least is taken: a polygon of no area
 * or a side of no length leaves the other candidates.
 *
 * checked: tests/test_ccd.c */

/* Differences of the pair x [4x3] into r [4x3]; returns how many there are: 3 or 4. */
CLOTHI_UNUSED static int clothi_pair_polygon(int edge_edge, const double *x, double *r) {
    if (!edge_edge) {
        clothi_sub3(x, x + 3, r);
        clothi_sub3(x, x + 6, r + 3);
        clothi_sub3(x, x + 9, r + 6);
        return 3;
    }
    clothi_sub3(x, x + 6, r);
    clothi_sub3(x + 3, x + 6, r + 3);
    clothi_sub3(x + 3, x + 9, r + 6);
    clothi_sub3(x, x + 9, r + 9);
    return 4;
}

/* The point v [3] of the polygon r [n x 3] nearest to the origin: v = sum lambda_k r_k. Returns
 * its side, from corner k to k + 1, or -1 inside. Needs |r| < 1e70, exact down to 1e-70. */
CLOTHI_UNUSED static int clothi_nearest(const double *r, int n, double *lambda, double *v) {
    double e1[3], e2[3], normal[3], c[3], best = HUGE_VAL, at = 0, nn;
    int    i, k, side = 0;
    for (i = 0; i < n; i++) {
        const double *a = r + 3 * i, *b = r + 3 * (i + 1 < n ? i + 1 : 0);
        double        e[3], p[3], ee, ae, t, d2;
        clothi_sub3(b, a, e);
        ee = clothi_dot3(e, e);
        ae = -clothi_dot3(a, e);
        t = !(ae > 0) ? 0 : ae < ee ? ae / ee : 1;
        for (k = 0; k < 3; k++) p[k] = t < 1 ? a[k] + t * e[k] : b[k];
        d2 = clothi_dot3(p, p);
        if (d2 < best) {
            best = d2;
            at = t;
            side = i;
            memcpy(v, p, sizeof p);
        }
    }
    memset(lambda, 0, 4 * sizeof *lambda);
    lambda[side] = 1 - at;
    lambda[side + 1 < n ? side + 1 : 0] = at;
    clothi_sub3(r + 3, r, e1);
    clothi_sub3(r + 3 * (n - 1), r, e2);
    clothi_cross3(e1, e2, normal);
    nn = clothi_dot3(normal, normal);
    if (nn > 0) {
        double s, t, p[3], d2;
        clothi_cross3(e2, r, c);
        s = clothi_dot3(c, normal);
        clothi_cross3(r, e1, c);
        t = clothi_dot3(c, normal);
        if (s < 0 || t < 0 || (n == 3 ? s + t > nn : s > nn || t > nn)) return side;
        s /= nn;
        t /= nn;
        for (k = 0; k < 3; k++) p[k] = r[k] + s * e1[k] + t * e2[k];
        d2 = clothi_dot3(p, p);
        if (d2 < best) {
            memcpy(v, p, sizeof p);
            lambda[0] = n == 3 ? 1 - s - t : (1 - s) * (1 - t);
            lambda[1] = n == 3 ? s : s * (1 - t);
            lambda[2] = n == 3 ? t : s * t;
            lambda[3] = n == 3 ? 0 : (1 - s) * t;
            side = -1;
        }
    }
    return side;
}

/* Weights of the four points, of sum 0, from those of the polygon's corners. */
CLOTHI_UNUSED static void clothi_pair_weights(int edge_edge, const double *lambda, double *w) {
    if (edge_edge) {
        w[1] = lambda[1] + lambda[2];
        w[0] = 1 - w[1];
        w[3] = -(lambda[2] + lambda[3]);
        w[2] = -1 - w[3];
    } else {
        w[0] = 1;
        w[2] = -lambda[1];
        w[3] = -lambda[2];
        w[1] = -1 - w[2] - w[3];
    }
}

/* The power of two that takes m > 0 to [1/2, 1), as far as doubles go. */
CLOTHI_UNUSED static double clothi_unit_scale(double m) {
    int e;
    (void)frexp(m, &e);
    return ldexp(1.0, e < -1022 ? 1022 : e > 1022 ? -1022 : -e);
}

CLOTHI_UNUSED static double clothi_pair_distance(int edge_edge, const double *x, double *w) {
    double    r[12], lambda[4], v[3], m = 0, scale = 1;
    const int n = clothi_pair_polygon(edge_edge, x, r);
    int       i;
    for (i = 0; i < 3 * n; i++) m = clothi_max(m, fabs(r[i]));
    if (m > 0 && !(m > 1e-60 && m < 1e60)) {
        scale = clothi_unit_scale(m);
        for (i = 0; i < 3 * n; i++) r[i] *= scale;
    }
    clothi_nearest(r, n, lambda, v);
    clothi_pair_weights(edge_edge, lambda, w);
    return sqrt(clothi_dot3(v, v)) / scale;
}

/* Distance of the vertex x [3] from the face of the next three points, m; w [4]: 1 and minus the
 * barycentric coordinates of the nearest point, so that sum w_i x_i spans the distance. */
CLOTHI_UNUSED static double clothi_point_triangle(const double *x, double *w) {
    return clothi_pair_distance(0, x, w);
}

/* Distance of the edge x [2x3] from the edge of the next two points, m; w [4]: weights of the
 * nearest points, positive for the first edge, negative for the second. */
CLOTHI_UNUSED static double clothi_edge_edge(const double *x, double *w) {
    return clothi_pair_distance(1, x, w);
}

/* ===== [4.1] CONTINUOUS DETECTION ============================================================
 *
 * The polygon of differences r_k(t) of section [3.2] must keep away from the origin by more than
 * s = min_sep. Time goes forward from one certified moment to the next, never by a root that was
 * merely computed [Mirtich 1996, Impulse-based dynamic simulation of rigid body systems, thesis,
 * chapter 2, conservative advancement]:
 *
 *        n                      one fixed direction n, the one to the nearest point at t:
 *     ---^--------- r_k         n.r_k is linear in t. As long as n.r_k > s for every corner the
 *        | s   o                plane stays between the polygon and the ball around the origin.
 *
 *     n(t) = n + x W            the same with a direction that turns with the side or plane that
 *                               the nearest point is on: n(t).r_k is quadratic, and near contact
 *                               the steps converge as those of Newton's method.
 *
 *     c(t) = det(e1, e2, r_0)   the polygon's own plane, e1 and e2 its sides: a cubic.
 *                               |c| > s |e1 x e2| as long as the plane misses the ball.
 *
 * The first two also hold for polygons of no area and pass beside a polygon; the third bridges
 * what is far from contact and slow approach. Polynomials, and the bound |e1 x e2| <= sum B_i
 * |n_i|, are in Bernstein form: the first point of the axis that their convex hull reaches is a
 * safe time. The furthest of the three counts. Contact is what none can exclude; for s = 0 it is
 * asked again with twice the digits.
 *
 * Rounding. u = 2^-53, m = the largest |difference|. A corner of r(t) is off by at most 4 u m per
 * axis, a product n.r with |n| = 1 by 13 u m in all: E = 16 u m is kept between s and what counts
 * as free, twice as much where a root of the linear function is taken, and four times as much,
 * times 1 + |W|, for the quadratic. The coefficients of c are off by at most 64 u m e^2, e the
 * largest |side|, splitting by 108 u m e^2, the root by 72 u m e^2: 256 u m e^2 is kept. m is
 * brought to about 1 by a power of two when it is beyond 1e-30 .. 1e30; sides below 1e-60 then
 * have no plane, as products of them underflow.
 *
 * checked: tests/test_ccd.c, tests/fuzz_ccd.c */

#define CLOTHI_CCD_STEPS 256                /* then contact: grazes by less than it can tell    */
#define CLOTHI_CCD_NEAR  (1.0 / 1048576)    /* contact: within s (1 + this)                     */

typedef struct clothi_ccd {
    int    n;                               /* corners                                          */
    double r0[12], r1[12];                  /* [n x 3] at t = 0 and 1                           */
    double s, m, E, scale;
    double floor;                           /* n.r above this is certainly above s              */
    int    has_cubic;
    double c[4], N[4];                      /* Bernstein on [0,1]: cubic, bound of its normal   */
    double e, E_c;                          /* largest |side|                                   */
} clothi_ccd;

/* Longest certified time from t with the fixed direction n, |n| = 1: t when there is none, 2 when
 * it lasts to the end. */
CLOTHI_UNUSED static double clothi_ccd_axis(const clothi_ccd *q, const double *n, double t) {
    double until = 2;
    int    k;
    for (k = 0; k < q->n; k++) {
        const double h0 = clothi_dot3(n, q->r0 + 3 * k), h1 = clothi_dot3(n, q->r1 + 3 * k);
        if (!((1 - t) * h0 + t * h1 > q->floor)) return t;
        if (!(h1 > q->floor)) until = clothi_min(until, (h0 - q->floor) / (h0 - h1));
    }
    return clothi_max(t, until);
}

/* Bernstein coefficients of the cubic and of the bound of its normal's length. */
CLOTHI_UNUSED static void clothi_ccd_cubic(clothi_ccd *q) {
    double a[2][3], b[2][3], n[3][3], p[3], e = 0, N[3];
    int    i, k;
    for (i = 0; i < 2; i++) {
        const double *r = i ? q->r1 : q->r0;
        clothi_sub3(r + 3, r, a[i]);
        clothi_sub3(r + 3 * (q->n - 1), r, b[i]);
        for (k = 0; k < 3; k++) e = clothi_max(e, clothi_max(fabs(a[i][k]), fabs(b[i][k])));
    }
    clothi_cross3(a[0], b[0], n[0]);
    clothi_cross3(a[0], b[1], n[1]);
    clothi_cross3(a[1], b[0], p);
    clothi_cross3(a[1], b[1], n[2]);
    for (k = 0; k < 3; k++) n[1][k] = 0.5 * (n[1][k] + p[k]);
    for (k = 0; k < 3; k++) N[k] = sqrt(clothi_dot3(n[k], n[k]));
    q->c[0] = clothi_dot3(n[0], q->r0);
    q->c[1] = (clothi_dot3(n[0], q->r1) + 2 * clothi_dot3(n[1], q->r0)) / 3;
    q->c[2] = (clothi_dot3(n[2], q->r0) + 2 * clothi_dot3(n[1], q->r1)) / 3;
    q->c[3] = clothi_dot3(n[2], q->r1);
    q->N[0] = N[0];
    q->N[1] = (N[0] + 2 * N[1]) / 3;
    q->N[2] = (N[2] + 2 * N[1]) / 3;
    q->N[3] = N[2];
    q->e = e;                               /* 2^-45; no plane where products underflow         */
    q->E_c = e > 1e-60 ? 2.842170943040401e-14 * q->m * e * e : HUGE_VAL;
    q->has_cubic = 1;
}

/* f [4] on [0,1] becomes f on [t,1]. */
CLOTHI_UNUSED static void clothi_bernstein_right(double *f, double t) {
    int i, k;
    for (k = 3; k > 0; k--)
        for (i = 0; i < k; i++) f[i] = (1 - t) * f[i] + t * f[i + 1];
}

/* f [4] on [0,1] becomes f on [0,t]. */
CLOTHI_UNUSED static void clothi_bernstein_left(double *f, double t) {
    int i, k;
    for (k = 1; k < 4; k++)
        for (i = 3; i >= k; i--) f[i] = (1 - t) * f[i - 1] + t * f[i];
}

/* Where the hull of f [n + 1] on [0,1], f[0] > 0, first meets 0; 2 when it does not. */
CLOTHI_UNUSED static double clothi_bernstein_first(const double *f, int n) {
    double first = 2;
    int    i, k;
    for (i = 1; i <= n; i++)
        for (k = 0; !(f[i] > 0) && k < i; k++)
            if (f[k] > 0)
                first = clothi_min(first, (k + (i - k) * (f[k] / (f[k] - f[i]))) / n);
    return first;
}

/* How fast n [3] must turn, W [3] from t to the end, to stay at right angles to the side or, for
 * -1, to the plane of the polygon, which is r now: W.e = -n.(change of e). 0: it has none. */
CLOTHI_UNUSED static int clothi_ccd_turn(const clothi_ccd *q, const double *r, int side,
                                         const double *n, double *W) {
    double e[2][3], to[2], c[2][3], normal[3], size;
    int    i, k;
    for (i = 0; i < (side < 0 ? 2 : 1); i++) {
        const int a = side < 0 ? 0 : 3 * side, last = 3 * (q->n - 1);
        const int b = side < 0 ? (i ? last : 3) : a < last ? a + 3 : 0;
        clothi_sub3(r + b, r + a, e[i]);
        for (to[i] = 0, k = 0; k < 3; k++)
            to[i] += n[k] * (e[i][k] - (q->r1[b + k] - q->r1[a + k]));
    }
    if (side < 0) {
        clothi_cross3(e[0], e[1], normal);
        clothi_cross3(e[1], normal, c[0]);
        clothi_cross3(normal, e[0], c[1]);
        size = clothi_dot3(normal, normal);
        for (k = 0; k < 3; k++) W[k] = (to[0] * c[0][k] + to[1] * c[1][k]) / size;
    } else {
        size = clothi_dot3(e[0], e[0]);
        for (k = 0; k < 3; k++) W[k] = to[0] * e[0][k] / size;
    }
    return size > 0;
}

/* Longest certified time from t with a direction that turns with the polygon, n + x W for x from
 * 0 to 1 between t and the end. A corner's distance is quadratic in x; |n + x W| is at most
 * 1 + x^2 W^2/2, as W is at right angles to n but for rounding. Up to x = 1 the hull is too wide,
 * so the first answer bounds the range for the next. */
CLOTHI_UNUSED static double clothi_ccd_turning(const clothi_ccd *q, const double *r, int side,
                                               const double *n, double t) {
    double W[3], a[4], b[4], c[4], ww, size, best = 0, h = 1;
    int    i, round;
    if (!clothi_ccd_turn(q, r, side, n, W)) return t;
    ww = clothi_dot3(W, W);
    size = fabs(W[0]) + fabs(W[1]) + fabs(W[2]);
    for (i = 0; i < q->n; i++) {
        const double wa = clothi_dot3(W, r + 3 * i);
        a[i] = clothi_dot3(n, r + 3 * i);
        b[i] = clothi_dot3(n, q->r1 + 3 * i) - a[i] + wa;
        c[i] = clothi_dot3(W, q->r1 + 3 * i) - wa;
    }
    for (round = 0; round < 3; round++) {
        const double floor = (q->s + 4 * q->E) * (1 + h * fabs(clothi_dot3(n, W)) + 1e-15) +
                             (4e-16 * q->s + 4 * q->E) * h * size;
        double       first = 2;
        for (i = 0; i < q->n; i++) {
            double f[3];
            f[0] = a[i] - floor;
            f[1] = a[i] + 0.5 * h * b[i] - floor;
            f[2] = a[i] + h * (b[i] + h * c[i]) - floor * (1 + 0.5 * (h * h * ww));
            if (!(f[0] > 0)) break;
            first = clothi_min(first, clothi_bernstein_first(f, 2));
        }
        if (i == q->n && first > 1 && h >= 1) return 2;
        if (i == q->n) best = clothi_max(best, h * clothi_min(first, 1));
        h = clothi_min(1, i == q->n ? 4 * best : 1e-3 * h);
    }
    return t + (1 - t) * best;
}

/* Longest certified time from t with the polygon's own plane, as clothi_ccd_axis. */
CLOTHI_UNUSED static double clothi_ccd_plane(clothi_ccd *q, double t) {
    double f[4], sign;
    int    i, round;
    if (!q->has_cubic) clothi_ccd_cubic(q);
    memcpy(f, q->c, sizeof f);
    clothi_bernstein_right(f, t);
    sign = f[0] < 0 ? -1 : 1;
    for (round = 0; round < 6; round++) {
        double x, h;
        for (i = 0; i < 4; i++)
            f[i] = sign * q->c[i] - q->s * (1 + 1e-14) * q->N[i] - q->E_c;
        clothi_bernstein_right(f, t);
        if (!(f[0] > 0)) return t;
        x = clothi_bernstein_first(f, 3);
        if (x > 1) return 2;
        h = clothi_min(1, 4 * x);           /* a narrower hull                                  */
        clothi_bernstein_left(f, h);
        x = clothi_max(x, h * clothi_min(1, clothi_bernstein_first(f, 3))) * (1 - t);
        t = t + x;
        if (x < 1e-13) break;
    }
    return t;
}

/* Direction out [3], |out| = 1, to the nearest point v of the polygon r on its side, -1 its
 * inside; 0 when there is none. */
CLOTHI_UNUSED static int clothi_ccd_direction(const double *r, int n, int side, const double *v,
                                              double *out) {
    double e1[3], e2[3], len;
    int    k;
    clothi_sub3(r + 3, r, e1);
    clothi_sub3(r + 3 * (n - 1), r, e2);
    if (side < 0) clothi_cross3(e1, e2, out);
    else {
        const double *a = r + 3 * side, *b = r + 3 * (side + 1 < n ? side + 1 : 0);
        double        ee, ve;
        clothi_sub3(b, a, e1);
        ee = clothi_dot3(e1, e1);
        ve = clothi_dot3(v, e1);
        memcpy(out, v, 3 * sizeof *v);
        if (ve * ve < 1e-8 * ee * clothi_dot3(v, v))    /* at right angles, but for rounding */
            for (k = 0; k < 3; k++) out[k] -= ve / ee * e1[k];
    }
    len = sqrt(clothi_dot3(out, out));
    if (!(len > 1e-120)) {                  /* squares underflow                                */
        const double m = clothi_max(fabs(out[0]), clothi_max(fabs(out[1]), fabs(out[2])));
        const double scale = m > 0 ? clothi_unit_scale(m) : 0;
        for (k = 0; k < 3; k++) out[k] *= scale;
        len = sqrt(clothi_dot3(out, out));
        if (!(len > 0.1)) return 0;
    }
    if (side < 0 && clothi_dot3(out, r) < 0) len = -len;
    for (k = 0; k < 3; k++) out[k] /= len;
    return 1;
}

/* The whole search in doubles, m in range. */
CLOTHI_UNUSED static int clothi_ccd_run(clothi_ccd *q, double *toi) {
    const double near = q->s * (1 + CLOTHI_CCD_NEAR) + 4 * q->E;
    double       t = 0;
    int          step, i;
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        double r[12], lambda[4], v[3], n[3], next = t, d;
        int    side, turned;
        for (i = 0; i < 3 * q->n; i++) r[i] = (1 - t) * q->r0[i] + t * q->r1[i];
        side = clothi_nearest(r, q->n, lambda, v);
        d = sqrt(clothi_dot3(v, v));
        turned = clothi_ccd_direction(r, q->n, side, v, n);
        if (turned) next = clothi_ccd_axis(q, n, t);
        if (next > 1) return 0;
        next = clothi_max(next, clothi_ccd_plane(q, t));
        if (next > 1) return 0;
        if (turned)
            next = clothi_max(next, clothi_ccd_turning(q, r, side, n, t));
        if (next > 1) return 0;
        if (!(next > t) && side >= 0 && clothi_ccd_direction(r, q->n, -1, v, n))
            next = clothi_ccd_axis(q, n, t);
        if (next > 1) return 0;
        if (!(next > t) || (d <= near && next - t < CLOTHI_CCD_NEAR)) {
            t = next;
            break;
        }
        t = next;
    }
    *toi = t;
    return 1;
}

/* ---- twice the digits: for min_sep = 0, where the search above ends in its own rounding. The
 * same two advances in numbers h + l of 106 bits, from the time reached so far. A sum is good to
 * 3 u^2, a product to 7 u^2 [Joldes, Muller, Popescu 2017, Tight and rigorous error bounds for
 * basic building blocks of double-word arithmetic, ACM TOMS 44, doi 10.1145/3121432]: 8 times the
 * counts above with u^2 for u, kept four times over. Steps are fractions of what is left of
 * [0,1], so that doubles do for them. */

typedef struct clothi_dd {
    double h, l;
} clothi_dd;

CLOTHI_UNUSED static clothi_dd clothi_dd_of(double h, double l) {
    clothi_dd c;
    clothi_two_sum(h, l, &c.h, &c.l);
    return c;
}

CLOTHI_UNUSED static clothi_dd clothi_dd_add(clothi_dd a, clothi_dd b) {
    double s, r, v, w;
    clothi_two_sum(a.h, b.h, &s, &r);
    clothi_two_sum(a.l, b.l, &v, &w);
    a = clothi_dd_of(s, r + v);
    return clothi_dd_of(a.h, w + a.l);
}

CLOTHI_UNUSED static clothi_dd clothi_dd_neg(clothi_dd a) {
    a.h = -a.h;
    a.l = -a.l;
    return a;
}

CLOTHI_UNUSED static clothi_dd clothi_dd_mul(clothi_dd a, clothi_dd b) {
    double p, r;
    clothi_two_product(a.h, b.h, &p, &r);
    return clothi_dd_of(p, r + (a.h * b.l + a.l * b.h));
}

CLOTHI_UNUSED static clothi_dd clothi_dd_dot(const clothi_dd *a, const clothi_dd *b) {
    return clothi_dd_add(clothi_dd_add(clothi_dd_mul(a[0], b[0]), clothi_dd_mul(a[1], b[1])),
                         clothi_dd_mul(a[2], b[2]));
}

CLOTHI_UNUSED static void clothi_dd_cross(const clothi_dd *a, const clothi_dd *b,
                                          clothi_dd *out) {
    int k;
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = clothi_dd_add(clothi_dd_mul(a[i], b[j]),
                               clothi_dd_neg(clothi_dd_mul(a[j], b[i])));
    }
}

/* out [n] = a + t (b - a) */
CLOTHI_UNUSED static void clothi_dd_mix(const clothi_dd *a, const clothi_dd *b, clothi_dd t,
                                        int n, clothi_dd *out) {
    const clothi_dd s = clothi_dd_add(clothi_dd_of(1, 0), clothi_dd_neg(t));
    int             k;
    for (k = 0; k < n; k++)
        out[k] = clothi_dd_add(clothi_dd_mul(s, a[k]), clothi_dd_mul(t, b[k]));
}

CLOTHI_UNUSED static void clothi_dd_sub(const clothi_dd *a, const clothi_dd *b, clothi_dd *out) {
    int k;
    for (k = 0; k < 3; k++) out[k] = clothi_dd_add(a[k], clothi_dd_neg(b[k]));
}

/* The foot p [3] of the perpendicular on the side from a to b, or the nearer end. */
CLOTHI_UNUSED static void clothi_dd_foot(const clothi_dd *a, const clothi_dd *b, clothi_dd *p) {
    clothi_dd e[3], ee, ae, rest;
    int       k, pass;
    clothi_dd_sub(b, a, e);
    ee = clothi_dd_dot(e, e);
    ae = clothi_dd_neg(clothi_dd_dot(a, e));
    rest = clothi_dd_add(ee, clothi_dd_neg(ae));
    memcpy(p, rest.h > 0 ? a : b, 3 * sizeof *p);
    if (!(ae.h > 0) || !(rest.h > 0)) return;
    for (pass = 0; pass < 3; pass++) {      /* each pass adds 52 bits */
        const clothi_dd dt = clothi_dd_of(-clothi_dd_dot(p, e).h / ee.h, 0);
        for (k = 0; k < 3; k++) p[k] = clothi_dd_add(p[k], clothi_dd_mul(dt, e[k]));
    }
}

/* Direction n [3] to the nearest point of the polygon r; returns the distance, 0: no direction. */
CLOTHI_UNUSED static double clothi_dd_direction(const clothi_dd *r, int n, clothi_dd *out) {
    clothi_dd e1[3], e2[3], normal[3], c[3], nn, s, t, g;
    double    best = HUGE_VAL, d, len;
    int       i;
    clothi_dd_sub(r + 3, r, e1);
    clothi_dd_sub(r + 3 * (n - 1), r, e2);
    clothi_dd_cross(e1, e2, normal);
    nn = clothi_dd_dot(normal, normal);
    clothi_dd_cross(e2, r, c);
    s = clothi_dd_dot(c, normal);
    clothi_dd_cross(r, e1, c);
    t = clothi_dd_dot(c, normal);
    g = clothi_dd_add(nn, clothi_dd_neg(n == 3 ? clothi_dd_add(s, t) : s.h > t.h ? s : t));
    if (nn.h > 0 && s.h >= 0 && t.h >= 0 && g.h >= 0) {
        g = clothi_dd_dot(normal, r);
        len = sqrt(nn.h) * (g.h < 0 ? -1 : 1);
        d = g.h / len;
        memcpy(out, normal, 3 * sizeof *out);
    } else {
        for (i = 0; i < n; i++) {
            clothi_dd p[3];
            clothi_dd_foot(r + 3 * i, r + 3 * (i + 1 < n ? i + 1 : 0), p);
            d = clothi_dd_dot(p, p).h;
            if (d < best) {
                best = d;
                memcpy(out, p, sizeof p);
            }
        }
        d = len = sqrt(best);
    }
    if (!(fabs(len) > 1e-150)) return 0;
    for (i = 0; i < 3; i++) out[i] = clothi_dd_mul(out[i], clothi_dd_of(1 / len, 0));
    return d;
}

/* Certified fraction of [t,1] with the direction n; 2: all of it. */
CLOTHI_UNUSED static double clothi_dd_axis(const clothi_dd *r0, const clothi_dd *r1, int corners,
                                           const clothi_dd *n, clothi_dd t, double floor) {
    double until = 2;
    int    k;
    for (k = 0; k < corners; k++) {
        clothi_dd h0 = clothi_dd_dot(n, r0 + 3 * k), h1 = clothi_dd_dot(n, r1 + 3 * k), g;
        clothi_dd_mix(&h0, &h1, t, 1, &g);
        if (!(g.h > 2 * floor)) return 0;
        if (!(h1.h > floor)) until = clothi_min(until, (g.h - floor) / (g.h - h1.h));
    }
    return until > 1 ? 2 : until * (1 - 1e-15);
}

/* The same with the polygon's own plane; c [4] Bernstein on [0,1], good to E. */
CLOTHI_UNUSED static double clothi_dd_plane(const clothi_dd *c, clothi_dd t, double E) {
    clothi_dd f[4];
    double    g[4], x;
    int       i, k;
    memcpy(f, c, sizeof f);
    for (k = 3; k > 0; k--) clothi_dd_mix(f, f + 1, t, k, f);
    for (i = 0; i < 4; i++) g[i] = (f[0].h < 0 ? -f[i].h : f[i].h) - E;
    if (!(g[0] > E)) return 0;
    x = clothi_bernstein_first(g, 3);
    return x > 1 ? 2 : x * (1 - 1e-15);
}

CLOTHI_UNUSED static void clothi_dd_cubic(const clothi_dd *r0, const clothi_dd *r1, int n,
                                          clothi_dd *c) {
    const clothi_dd third = clothi_dd_of(1.0 / 3, 1.850371707708594e-17);
    clothi_dd       a[2][3], b[2][3], m[4][3];
    int             i;
    for (i = 0; i < 2; i++) {
        const clothi_dd *r = i ? r1 : r0;
        clothi_dd_sub(r + 3, r, a[i]);
        clothi_dd_sub(r + 3 * (n - 1), r, b[i]);
    }
    clothi_dd_cross(a[0], b[0], m[0]);
    clothi_dd_cross(a[0], b[1], m[1]);
    clothi_dd_cross(a[1], b[0], m[2]);
    clothi_dd_cross(a[1], b[1], m[3]);
    for (i = 0; i < 3; i++) m[1][i] = clothi_dd_add(m[1][i], m[2][i]);
    c[0] = clothi_dd_dot(m[0], r0);
    c[1] = clothi_dd_add(clothi_dd_dot(m[0], r1), clothi_dd_dot(m[1], r0));
    c[2] = clothi_dd_add(clothi_dd_dot(m[3], r0), clothi_dd_dot(m[1], r1));
    c[3] = clothi_dd_dot(m[3], r1);
    c[1] = clothi_dd_mul(c[1], third);
    c[2] = clothi_dd_mul(c[2], third);
}

/* From *toi on for min_sep = 0: 0 when the rest of the motion is free, else 1 and the time. */
CLOTHI_UNUSED static int clothi_dd_run(int n, const clothi_dd *r0, const clothi_dd *r1, double m,
                                       double e, double *toi) {
    const double E = 1.262177448353619e-29 * m;                    /* 2^-96 */
    const double E_c = e > 1e-60 ? 2.019483917365790e-28 * m * e * e : HUGE_VAL;
    clothi_dd    c[4], t = clothi_dd_of(*toi, 0), x[2];
    int          step;
    clothi_dd_cubic(r0, r1, n, c);
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        clothi_dd    r[12], dir[3];
        double       next;
        clothi_dd_mix(r0, r1, t, 3 * n, r);
        next = clothi_dd_direction(r, n, dir) > 0 ? clothi_dd_axis(r0, r1, n, dir, t, E) : 0;
        if (next < 2) next = clothi_max(next, clothi_dd_plane(c, t, E_c));
        if (next > 1) return 0;
        if (!(next > 1e-31)) break;
        x[0] = clothi_dd_of(1, 0);
        clothi_dd_mix(&t, x, clothi_dd_of(next, 0), 1, x + 1);
        t = x[1];
    }
    /* t is off by rounding over slope: 4e-20 beyond a contact at 4e-7 was seen in 200 000 */
    *toi = clothi_max(*toi, clothi_min(1, t.h - 1e-15));
    return 1;
}

/* Differences of the pair x [4x3] times a power of two, without error. */
CLOTHI_UNUSED static void clothi_dd_polygon(int edge_edge, const double *x, double scale,
                                            clothi_dd *r) {
    static const unsigned char of[2][8] = {{0, 1, 0, 2, 0, 3, 0, 3}, {0, 2, 1, 2, 1, 3, 0, 3}};
    int                        i, k;
    for (i = 0; i < 4; i++)
        for (k = 0; k < 3; k++) {
            const double a = x[3 * of[edge_edge][2 * i] + k];
            const double b = x[3 * of[edge_edge][2 * i + 1] + k];
            clothi_dd    c = clothi_dd_of(a, -b);
            c.h *= scale;
            c.l *= scale;
            r[3 * i + k] = c;
        }
}

/* A contact beyond doubt, which needs no more digits: around t the plane passes through the
 * origin, which is well inside of the polygon. */
CLOTHI_UNUSED static int clothi_ccd_plain(const clothi_ccd *q, double t) {
    const double dt = CLOTHI_CCD_NEAR;
    double       r[12], lambda[4], v[3], before[4], after[4];
    int          i;
    if (t < dt || t > 1 - dt) return 0;
    for (i = 0; i < 3 * q->n; i++) r[i] = (1 - t) * q->r0[i] + t * q->r1[i];
    if (clothi_nearest(r, q->n, lambda, v) >= 0) return 0;
    for (i = 0; i < q->n; i++)
        if (!(lambda[i] > 1e-4)) return 0;
    memcpy(before, q->c, sizeof before);
    memcpy(after, q->c, sizeof after);
    clothi_bernstein_right(before, t - dt);
    clothi_bernstein_right(after, t + dt);
    return (before[0] > q->E_c && after[0] < -q->E_c) ||
           (before[0] < -q->E_c && after[0] > q->E_c);
}

/* One of the three axes keeps the polygon away all the time. */
CLOTHI_UNUSED static int clothi_ccd_boxes(const clothi_ccd *q) {
    int i, k;
    for (k = 0; k < 3; k++) {
        double lo = clothi_min(q->r0[k], q->r1[k]), hi = clothi_max(q->r0[k], q->r1[k]);
        for (i = k + 3; i < 3 * q->n; i += 3) {
            lo = clothi_min(lo, clothi_min(q->r0[i], q->r1[i]));
            hi = clothi_max(hi, clothi_max(q->r0[i], q->r1[i]));
        }
        if (lo > q->floor || -hi > q->floor) return 1;
    }
    return 0;
}

/* The differences, their size and the bounds; 0 when the largest is 0 or too large. */
CLOTHI_UNUSED static int clothi_ccd_load(clothi_ccd *q, int edge_edge, const double *xa,
                                         const double *xb, double min_sep) {
    int i;
    q->n = clothi_pair_polygon(edge_edge, xa, q->r0);
    clothi_pair_polygon(edge_edge, xb, q->r1);
    q->s = min_sep > 0 ? min_sep : 0;
    q->scale = 1;
    q->has_cubic = 0;
    for (q->m = 0, i = 0; i < 3 * q->n; i++)
        q->m = clothi_max(q->m, clothi_max(fabs(q->r0[i]), fabs(q->r1[i])));
    if (!(q->m > 0 && q->m < 1e307)) return 0;
    if (!(q->m > 1e-30 && q->m < 1e30)) {
        q->scale = clothi_unit_scale(q->m);
        q->m *= q->scale;
        q->s *= q->scale;
        for (i = 0; i < 3 * q->n; i++) {
            q->r0[i] *= q->scale;
            q->r1[i] *= q->scale;
        }
    }
    q->E = 1.7763568394002505e-15 * q->m;   /* 2^-49 */
    q->floor = q->s * (1 + 1e-15) + 2 * q->E;
    return 1;
}

CLOTHI_UNUSED static int clothi_ccd_pair(int edge_edge, const double *xa, const double *xb,
                                         double min_sep, double *toi) {
    clothi_ccd q;
    *toi = 0;
    if (clothi_find_nonfinite(xa, 12) >= 0 || clothi_find_nonfinite(xb, 12) >= 0 ||
        !clothi_finite(min_sep))
        return 1;
    if (!clothi_ccd_load(&q, edge_edge, xa, xb, min_sep)) {
        double small[24];
        int    i;
        if (q.m <= 0) return 1;
        for (i = 0; i < 24; i++)            /* a difference may be beyond the doubles           */
            small[i] = (1.0 / 256) * (i < 12 ? xa[i] : xb[i - 12]);
        return clothi_ccd_pair(edge_edge, small, small + 12, (1.0 / 256) * min_sep, toi);
    }
    if (!(q.s < 4 * q.m)) return 1;         /* all of it is within min_sep                      */
    *toi = 1;
    if (clothi_ccd_boxes(&q) || !clothi_ccd_run(&q, toi)) return 0;
    if (q.s <= 0 && !clothi_ccd_plain(&q, *toi)) {
        clothi_dd r0[12], r1[12];
        clothi_dd_polygon(edge_edge, xa, q.scale, r0);
        clothi_dd_polygon(edge_edge, xb, q.scale, r1);
        return clothi_dd_run(q.n, r0, r1, q.m, q.e, toi);
    }
    return 1;
}

CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi) {
    double    when;
    const int hit = clothi_ccd_pair(0, xa, xb, min_sep, &when);
    if (toi) *toi = hit ? when : 1;
    return hit;
}

CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi) {
    double    when;
    const int hit = clothi_ccd_pair(1, xa, xb, min_sep, &when);
    if (toi) *toi = hit ? when : 1;
    return hit;
}

/* Weights w [4] (clothi_pair_weights) and unit normal n [3] of a contact found at toi, such that
 * g = n.sum w_i x_i at xa, which is returned, is positive: the side held at the start. n is the
 * direction of the distance at toi; where that is lost in rounding, the normal of the face or of
 * both edges; where that has no side at the start, the direction of the distance at the start.
 * 0 is returned when the two touch at the start; n is then one of these, or the x axis. */
CLOTHI_UNUSED static double clothi_contact_frame(int edge_edge, const double *xa,
                                                 const double *xb, double toi, double *w,
                                                 double *n) {
    double    r0[12], r[12], m = 0, m0 = 0, scale, g = 0, start[3] = {0, 0, 0};
    double    lambda[4] = {1, 0, 0, 0}, v[3] = {0, 0, 0};  /* squares overflow: nothing is near */
    const int corners = clothi_pair_polygon(edge_edge, xa, r0);
    int       i, k, way;
    clothi_pair_polygon(edge_edge, xb, r);
    for (i = 0; i < 3 * corners; i++) {
        m0 = clothi_max(m0, fabs(r0[i]));
        m = clothi_max(m, fabs(r[i]));
    }
    scale = m > 0 || m0 > 0 ? clothi_unit_scale(clothi_max(m, m0)) : 1;
    for (i = 0; i < 3 * corners; i++)
        r[i] = (1 - toi) * (r0[i] * scale) + toi * (r[i] * scale);
    scale = m0 > 0 ? clothi_unit_scale(m0) : 1;
    for (i = 0; i < 3 * corners; i++) r0[i] *= scale;
    way = clothi_nearest(r, corners, lambda, v);
    clothi_pair_weights(edge_edge, lambda, w);
    for (i = 0; i < corners; i++)
        for (k = 0; k < 3; k++) start[k] += lambda[i] * r0[3 * i + k];
    for (i = 0; i < 3; i++) {
        int found;
        if (i == 0) found = clothi_dot3(v, v) > 1e-22 &&
                            clothi_ccd_direction(r, corners, way, v, n);
        else if (i == 1) found = clothi_ccd_direction(r, corners, -1, v, n);
        else {
            way = clothi_nearest(r0, corners, lambda, v);
            found = clothi_ccd_direction(r0, corners, way, v, n);
        }
        if (!found) continue;
        g = clothi_dot3(n, start);
        if (i == 1 && g < 0) {
            for (k = 0; k < 3; k++) n[k] = -n[k];
            g = -g;
        }
        if (g > (i < 2 ? 1e-12 : 0)) return g / scale;
    }
    if (!(fabs(clothi_dot3(n, n) - 1) < 1e-9)) {
        n[0] = 1;
        n[1] = n[2] = 0;
    }
    return 0;
}

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
 * in   pad     m, >= 0. Points come within D of each other only if their boxes with pads p, q that
 *              add up to D (but for rounding) overlap: from a + p >= b - q follows, rounding being
 *              monotone, fl(a + p) >= fl(b - q) */
CLOTHI_UNUSED static void clothi_swept_boxes(int n, const double *xa, const double *xb,
                                             double pad, double *box) {
    int i, k;
    if (!xb) xb = xa;
    pad *= 1 + 1e-15;                       /* the rounding of the pads' own sum               */
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            const double a = xa[3 * i + k], b = xb[3 * i + k];
            box[6 * i + k] = (a < b ? a : b) - pad;
            box[6 * i + 3 + k] = (a < b ? b : a) + pad;
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
    const __m128 below = _mm_cmple_ps(_mm_loadu_ps(a->lo), _mm_loadu_ps(b->hi));
    const __m128 above = _mm_cmple_ps(_mm_loadu_ps(b->lo), _mm_loadu_ps(a->hi));
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
#if defined(CLOTHI_AVX) || defined(CLOTHI_SSE2)
    _mm_storeu_ps(out->lo, _mm_min_ps(_mm_loadu_ps(a->lo), _mm_loadu_ps(b->lo)));
    _mm_storeu_ps(out->hi, _mm_max_ps(_mm_loadu_ps(a->hi), _mm_loadu_ps(b->hi)));
#else
    int k;
    for (k = 0; k < 4; k++) {
        out->lo[k] = a->lo[k] < b->lo[k] ? a->lo[k] : b->lo[k];
        out->hi[k] = a->hi[k] > b->hi[k] ? a->hi[k] : b->hi[k];
    }
#endif
}

static inline void clothi_node_measure(clothi_box *b) {
    b->lo[3] = (b->hi[0] - b->lo[0]) + (b->hi[1] - b->lo[1]) + (b->hi[2] - b->lo[2]);
    b->hi[3] = 0;
}

/* A box [6] rounded outward. */
static inline void clothi_node_around(const double *box, clothi_box *out) {
    int k;
    for (k = 0; k < 3; k++) {
        out->lo[k] = clothi_float_below(box[k]);
        out->hi[k] = clothi_float_above(box[3 + k]);
    }
    out->lo[3] = out->hi[3] = 0;
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
    int         i = clothi_bvh_item(t, leaf, t->depth);
    clothi_node_empty(node);
    for (; i < end; i++) {
        const double *b = box + 6 * (size_t)t->item[i];
        clothi_box   *r = t->bound + i;
        memcpy(t->exact + 6 * (size_t)i, b, 6 * sizeof *b);
        clothi_node_around(b, r);
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
    int        stack[CLOTHI_BVH_STACK], n = 0, count = 0, i;
    clothi_node_around(box, &b);
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

/* A face with its boxes; those of its edges only when they are asked for. */
typedef struct clothi_face_view {
    const int *v, *e;
    int        face, owned, edges;
    double     box[6], edge[3][6];
} clothi_face_view;

static void clothi_face_look(const clothi_features_job *job, int face, clothi_face_view *w) {
    w->face = face;
    w->edges = 0;
    w->v = job->s->faces + 3 * (size_t)face;
    w->e = job->s->face_edges + 3 * (size_t)face;
    w->owned = job->s->owned[face];
    clothi_box_join(job->box + 6 * (size_t)w->v[0], job->box + 6 * (size_t)w->v[1], w->box);
    clothi_box_join(w->box, job->box + 6 * (size_t)w->v[2], w->box);
}

static void clothi_face_edges(const clothi_features_job *job, clothi_face_view *w) {
    int k;
    if (w->edges) return;
    for (k = 0; k < 3; k++)
        clothi_box_join(job->box + 6 * (size_t)w->v[k],
                        job->box + 6 * (size_t)w->v[k == 2 ? 0 : k + 1], w->edge[k]);
    w->edges = 1;
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
static void clothi_feature_ee(const clothi_features_job *job, clothi_face_view *f,
                              clothi_face_view *g, clothi_segment *out) {
    int k, l;
    if (f->owned < 8 || g->owned < 8) return;
    clothi_face_edges(job, f);
    for (k = 0; k < 3; k++) {
        const int a = f->v[k], b = f->v[k == 2 ? 0 : k + 1];
        if (!(f->owned >> (3 + k) & 1) || !clothi_boxes_meet(f->edge[k], g->box)) continue;
        clothi_face_edges(job, g);
        for (l = 0; l < 3; l++) {
            const int c = g->v[l], d = g->v[l == 2 ? 0 : l + 1];
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
            clothi_feature_ee(job, &f, &g, &ee);
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

/* ===== [5.2] TRIANGLES THAT INTERSECT =========================================================
 *
 *        a                  Two faces intersect when the closed triangles have a point in common
 *       /|\                 that does not lie on what they share by vertex number: nothing, a
 *      / |.\.....d          vertex, an edge. Touching counts; a face on top of its twin (three
 *     /  X  \   /           shared vertices) does not. A triangle without area is the segment or
 *    v---|---b /            the point that its corners span.
 *     \  |    /
 *      ..|.../                0 shared   they meet iff an edge of one meets the other: a corner
 *        c                               of the common part lies on an edge of one of them.
 *                             1, v       a ray from v through a common point leaves one of the
 *                                        triangles first, on its side opposite v: they meet
 *                                        beyond v iff ab meets vcd or cd meets vab.
 *                             2          in one plane, on the same side of the edge.
 *
 *   Every answer is a combination of signs of determinants, and those are exact [3.1]: of four
 *   points in space, or of three in a projection along an axis. An edge pq meets a triangle
 *   whose plane it crosses iff the volumes pq t0t1, pq t1t2, pq t2t0 do not have both signs; in
 *   the plane, plane geometry in a projection that does not flatten it. On one line the order is
 *   that of coordinates, x first, then y, then z. No rounding decides; there is no epsilon.
 * checked: tests/test_intersect.c, against rational arithmetic (tests/exact.h) */

/* Sign of the volume a b c d; at once when all are at one height, as in a sheet before it falls. */
static int clothi_volume(const double *a, const double *b, const double *c, const double *d) {
    int k;
    for (k = 0; k < 3; k++)
        if (a[k] == b[k] && a[k] == c[k] && a[k] == d[k]) return 0;
    return clothi_orient3d(a, b, c, d);
}

/* Turn of the projection of a, b, c along an axis: 0 when on a line. */
static int clothi_turn_of(const double *a, const double *b, const double *c, int axis) {
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    double    p[3][2];
    p[0][0] = a[i]; p[0][1] = a[j];
    p[1][0] = b[i]; p[1][1] = b[j];
    p[2][0] = c[i]; p[2][1] = c[j];
    return clothi_orient2d(p[0], p[1], p[2]);
}

/* An axis along which the triangle keeps an area, -1 when it has none. */
static int clothi_open_axis(const double *a, const double *b, const double *c) {
    int axis;
    for (axis = 2; axis >= 0; axis--)
        if (clothi_turn_of(a, b, c, axis)) return axis;
    return -1;
}

/* Order of points, x first: along any line it is that of the line. */
static int clothi_point_order(const double *a, const double *b) {
    int k;
    for (k = 0; k < 3; k++)
        if (a[k] < b[k] || a[k] > b[k]) return a[k] < b[k] ? -1 : 1;
    return 0;
}

/* -1, 0, 1: p before, on, behind the segment ab, all three on one line. */
static int clothi_beside(const double *p, const double *a, const double *b) {
    const int from_a = clothi_point_order(p, a), from_b = clothi_point_order(p, b);
    return from_a * from_b > 0 ? from_a : 0;
}

/* Closed segments pq and rs in one plane, which keeps its area along the axis. */
static int clothi_segments_in_plane(const double *p, const double *q, const double *r,
                                    const double *s, int axis) {
    const int sr = clothi_turn_of(p, q, r, axis), ss = clothi_turn_of(p, q, s, axis);
    const int sp = clothi_turn_of(r, s, p, axis), sq = clothi_turn_of(r, s, q, axis);
    if (sr * ss < 0 && sp * sq < 0) return 1;
    return (sr == 0 && clothi_beside(r, p, q) == 0) || (ss == 0 && clothi_beside(s, p, q) == 0) ||
           (sp == 0 && clothi_beside(p, r, s) == 0) || (sq == 0 && clothi_beside(q, r, s) == 0);
}

/* Closed segments anywhere. */
static int clothi_segments_meet(const double *p, const double *q, const double *r,
                                const double *s) {
    int axis;
    if (clothi_volume(p, q, r, s)) return 0;
    axis = clothi_open_axis(p, q, r);
    if (axis < 0) axis = clothi_open_axis(p, q, s);
    if (axis < 0) axis = clothi_open_axis(r, s, p);
    if (axis < 0) axis = clothi_open_axis(r, s, q);
    if (axis >= 0) return clothi_segments_in_plane(p, q, r, s, axis);
    return clothi_beside(p, r, s) == 0 || clothi_beside(q, r, s) == 0 ||
           clothi_beside(r, p, q) == 0;
}

/* 1 when the signs do not have both -1 and 1. */
static int clothi_one_sign(int a, int b, int c) {
    return !((a < 0 || b < 0 || c < 0) && (a > 0 || b > 0 || c > 0));
}

/* Segment pq, whose ends have the signs sp and sq against the plane of t, and the closed triangle
 * t, which has an area. */
static int clothi_edge_meets(const double *p, const double *q, int sp, int sq,
                             const double *const *t) {
    int k, axis;
    if (sp * sq > 0) return 0;
    if (sp || sq)
        return clothi_one_sign(clothi_volume(p, q, t[0], t[1]),
                               clothi_volume(p, q, t[1], t[2]),
                               clothi_volume(p, q, t[2], t[0]));
    axis = clothi_open_axis(t[0], t[1], t[2]);
    if (clothi_one_sign(clothi_turn_of(t[0], t[1], p, axis),
                        clothi_turn_of(t[1], t[2], p, axis),
                        clothi_turn_of(t[2], t[0], p, axis)))
        return 1;
    for (k = 0; k < 3; k++)
        if (clothi_segments_in_plane(p, q, t[k], t[(k + 1) % 3], axis)) return 1;
    return 0;
}

/* Signs of the corners of g against the plane of f; 1 when all are on one side. */
static int clothi_plane_signs(const double *const *f, const double *const *g, int *sign) {
    int k;
    for (k = 0; k < 3; k++) sign[k] = clothi_volume(f[0], f[1], f[2], g[k]);
    return sign[0] && sign[0] == sign[1] && sign[1] == sign[2];
}

/* Closed triangles without a shared vertex. */
static int clothi_triangles_meet(const double *const *f, const double *const *g) {
    int of_f[3], of_g[3], f_area, g_area, k, l;
    if (clothi_plane_signs(f, g, of_g) || clothi_plane_signs(g, f, of_f)) return 0;
    f_area = of_g[0] || of_g[1] || of_g[2] || clothi_open_axis(f[0], f[1], f[2]) >= 0;
    g_area = of_f[0] || of_f[1] || of_f[2] || clothi_open_axis(g[0], g[1], g[2]) >= 0;
    for (k = 0; k < 3; k++) {
        l = (k + 1) % 3;
        if (f_area && clothi_edge_meets(g[k], g[l], of_g[k], of_g[l], f)) return 1;
        if (g_area && clothi_edge_meets(f[k], f[l], of_f[k], of_f[l], g)) return 1;
    }
    if (f_area || g_area) return 0;
    for (k = 0; k < 9; k++)
        if (clothi_segments_meet(f[k / 3], f[(k / 3 + 1) % 3], g[k % 3], g[(k % 3 + 1) % 3]))
            return 1;
    return 0;
}

/* p, not v, in the closed angle c v d of a triangle with area. */
static int clothi_in_angle(const double *v, const double *c, const double *d, const double *p) {
    const int axis = clothi_open_axis(v, c, d);
    int       turn;
    if (clothi_point_order(p, v) == 0 || clothi_volume(v, c, d, p)) return 0;
    turn = clothi_turn_of(v, c, d, axis);
    return clothi_turn_of(v, c, p, axis) * turn >= 0 && clothi_turn_of(v, p, d, axis) * turn >= 0;
}

/* a and c, neither of them v, in one direction from v. */
static int clothi_one_way(const double *v, const double *a, const double *c) {
    const int order = clothi_point_order(a, v);
    return order && clothi_point_order(c, v) == order && clothi_open_axis(v, a, c) < 0;
}

/* Triangles f = v a b and g = v c d. One without area is two segments from v. */
static int clothi_meet_beyond_vertex(const double *const *f, const double *const *g) {
    const double *v = f[0];
    const int     c = clothi_volume(v, f[1], f[2], g[1]);
    const int     d = clothi_volume(v, f[1], f[2], g[2]);
    int           a, b, f_area, g_area;
    if (c * d > 0) return 0;
    a = clothi_volume(v, g[1], g[2], f[1]);
    b = clothi_volume(v, g[1], g[2], f[2]);
    if (a * b > 0) return 0;
    f_area = c || d || clothi_open_axis(v, f[1], f[2]) >= 0;
    g_area = a || b || clothi_open_axis(v, g[1], g[2]) >= 0;
    if (f_area && g_area)
        return clothi_edge_meets(f[1], f[2], a, b, g) || clothi_edge_meets(g[1], g[2], c, d, f);
    if (g_area)
        return clothi_in_angle(v, g[1], g[2], f[1]) || clothi_in_angle(v, g[1], g[2], f[2]);
    if (f_area)
        return clothi_in_angle(v, f[1], f[2], g[1]) || clothi_in_angle(v, f[1], f[2], g[2]);
    return clothi_one_way(v, f[1], g[1]) || clothi_one_way(v, f[1], g[2]) ||
           clothi_one_way(v, f[2], g[1]) || clothi_one_way(v, f[2], g[2]);
}

/* Triangles u w a and u w b. Without area: segments along the line of the edge, or from u = w. */
static int clothi_meet_beyond_edge(const double *u, const double *w, const double *a,
                                   const double *b) {
    int axis, side;
    if (clothi_volume(u, w, a, b)) return 0;
    axis = clothi_open_axis(u, w, a);
    if (axis >= 0) return clothi_turn_of(u, w, a, axis) * clothi_turn_of(u, w, b, axis) > 0;
    if (clothi_open_axis(u, w, b) >= 0 || clothi_open_axis(u, a, b) >= 0) return 0;
    side = clothi_beside(a, u, w);
    return side && clothi_beside(b, u, w) == side;
}

/* Faces f [3] and g [3], no corner named twice, of finite positions x: 1 when they intersect as
 * the banner says.   cost: 6 signs when apart or beside each other, up to ~100 in one plane */
CLOTHI_UNUSED static int clothi_faces_intersect(const double *x, const int *f, const int *g) {
    const double *p[3], *q[3];
    int           shared = 0, at_f[3], at_g[3], i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (f[i] == g[j]) {
                at_f[shared] = i;
                at_g[shared++] = j;
            }
    if (shared == 3) return 0;
    if (shared == 2)
        return clothi_meet_beyond_edge(x + 3 * (size_t)f[at_f[0]], x + 3 * (size_t)f[at_f[1]],
                                       x + 3 * (size_t)f[3 - at_f[0] - at_f[1]],
                                       x + 3 * (size_t)g[3 - at_g[0] - at_g[1]]);
    for (i = 0; i < 3; i++) {               /* a shared vertex comes first */
        p[i] = x + 3 * (size_t)f[(i + (shared ? at_f[0] : 0)) % 3];
        q[i] = x + 3 * (size_t)g[(i + (shared ? at_g[0] : 0)) % 3];
    }
    return shared ? clothi_meet_beyond_vertex(p, q) : clothi_triangles_meet(p, q);
}

#define CLOTHI_CROSSING_CHUNK 1024          /* pairs of faces that a task takes                */

typedef struct clothi_crossing_job {
    const double       *x;
    const int          *faces;
    const clothi_pairs *candidates;
    clothi_pairs       *out;
} clothi_crossing_job;

static void clothi_crossing_range(int begin, int end, int worker, void *ctx) {
    const clothi_crossing_job *job = (const clothi_crossing_job *)ctx;
    int task, i;
    (void)worker;
    for (task = begin; task < end; task++) {
        const int n = job->candidates->count, from = task * CLOTHI_CROSSING_CHUNK;
        const int to = n - from < CLOTHI_CROSSING_CHUNK ? n : from + CLOTHI_CROSSING_CHUNK;
        clothi_segment out = clothi_segment_open(job->out, task);
        for (i = from; i < to; i++) {
            const int *pair = job->candidates->pair + 2 * (size_t)i;
            if (clothi_faces_intersect(job->x, job->faces + 3 * (size_t)pair[0],
                                       job->faces + 3 * (size_t)pair[1]))
                clothi_segment_put(&out, pair[0], pair[1]);
        }
        job->out->found[task] = out.found;
    }
}

/* Those of the candidates, pairs of faces [nf x 3] whose boxes at x [nv x 3] overlap, that
 * intersect; in their order.
 * out  out     count and pair [count x 2], not the same list as candidates
 * returns CLOTH_OK, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY; out empty then
 * contract: alloc when out outgrows its memory | ~0.1 us a candidate | same list for any worker
 *   count */
CLOTHI_UNUSED static cloth_status clothi_crossing_pairs(const cloth_hooks *hooks, const double *x,
                                                        const int *faces,
                                                        const clothi_pairs *candidates,
                                                        clothi_pairs *out) {
    clothi_crossing_job job;
    job.x = x;
    job.faces = faces;
    job.candidates = candidates;
    job.out = out;
    return clothi_pairs_run(hooks, &out, 1,
                            candidates->count / CLOTHI_CROSSING_CHUNK +
                                (candidates->count % CLOTHI_CROSSING_CHUNK != 0),
                            4, clothi_crossing_range, &job);
}

/* The list in increasing order of (first, second), all in [0, n). */
CLOTHI_UNUSED static cloth_status clothi_pairs_sort(const cloth_hooks *hooks, int n,
                                                    clothi_pairs *p) {
    const size_t m = (size_t)p->count;
    int         *work, *key, *in, *out, *count, i, k;
    if (p->count < 2) return CLOTH_OK;
    work = (int *)clothi_alloc(hooks, 5 * m + (size_t)n + 1u, sizeof *work);
    if (!work)
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to sort %i pairs", p->count);
    key = work + 2 * m;
    in = key + m;
    out = in + m;
    count = out + m;
    for (k = 1; k >= 0; k--) {
        for (i = 0; i < p->count; i++) key[i] = p->pair[2 * i + k];
        clothi_sort_by(p->count, n, key, k ? NULL : in, k ? in : out, count);
    }
    for (i = 0; i < p->count; i++) memcpy(work + 2 * i, p->pair + 2 * out[i], 2 * sizeof *work);
    memcpy(p->pair, work, 2 * m * sizeof *work);
    clothi_free(hooks, work);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_intersections(const cloth_hooks *hooks, int nv, const double *x,
                                           int nf, const int *faces, int max_pairs, int *pairs,
                                           int *count) {
    cloth_status status;
    double      *box = NULL;
    ptrdiff_t    bad;
    clothi_bvh   tree;
    clothi_pairs near_by, found;
    memset(&tree, 0, sizeof tree);
    memset(&near_by, 0, sizeof near_by);
    memset(&found, 0, sizeof found);
    if (count) *count = 0;
    if ((!x && nv > 0) || (!faces && nf > 0) || (!pairs && max_pairs > 0) || max_pairs < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_intersections: %s", max_pairs < 0 ? "max_pairs < 0"
                           : !x && nv > 0 ? "x is NULL" : !faces && nf > 0 ? "faces is NULL"
                           : "pairs is NULL");
    status = clothi_check_counts(hooks, nv, nf);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status != CLOTH_OK) return status;
    bad = clothi_find_nonfinite(x, 3 * (size_t)nv);
    if (bad >= 0)
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "cloth_intersections: x[%z] = %g",
                           (size_t)bad, x[bad]);
    box = (double *)clothi_alloc(hooks, 6 * ((size_t)nv + (size_t)nf), sizeof *box);
    if (!box) {
        status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for the boxes of %i faces", nf);
        goto done;
    }
    clothi_swept_boxes(nv, x, NULL, 0, box);
    clothi_face_boxes(nf, faces, box, box + 6 * (size_t)nv);
    status = clothi_bvh_build(hooks, nf, box + 6 * (size_t)nv, &tree);
    if (status == CLOTH_OK) status = clothi_bvh_self_pairs(hooks, &tree, &near_by);
    if (status == CLOTH_OK) status = clothi_crossing_pairs(hooks, x, faces, &near_by, &found);
    if (status == CLOTH_OK) status = clothi_pairs_sort(hooks, nf, &found);
    if (status != CLOTH_OK) goto done;
    if (count) *count = found.count;
    if (found.count < max_pairs) max_pairs = found.count;
    if (max_pairs > 0) memcpy(pairs, found.pair, 2 * (size_t)max_pairs * sizeof *pairs);
done:
    clothi_pairs_free(hooks, &found);
    clothi_pairs_free(hooks, &near_by);
    clothi_bvh_free(hooks, &tree);
    clothi_free(hooks, box);
    return status;
}

/* ===== [6.1] QUADRATIC PROGRAM ===============================================================
 *
 *        \ row 1    x0              primal  min 1/2 sum (x-x0)^2/minv   s.t.  G x <= h
 *         \        /                dual    min 1/2 l'A l - b'l         s.t.  l >= 0
 *  allowed \      /  - minv G'l             A = G minv G',  b = G x0 - h
 *           \    v                  optimum x = x0 - minv G'l,  w = h - G x >= 0,  l >= 0,
 *            o--x------- row 2              l_i w_i = 0 in every row
 *
 * A projection in the metric of the masses: x0 goes to the nearest allowed point, pulled by the
 * multipliers l of the rows that hold it. Strictly convex in x: x is unique; l is where the active
 * rows are independent. A is semidefinite, m x m, sparse: rows couple that share a free unknown.
 *
 *   scale     row i over a power of two, so that 1/4 <= a_ii < 1: exact. Unknowns with minv = 0 go
 *             into h. A row without a free unknown is dropped, or proves infeasibility by itself.
 *             Of rows equal but for rounding the tightest stays.
 *   order     reverse Cuthill-McKee [CM69]: L of any set of rows has a small profile, and its
 *             inner loop is a dot product of two stretches of memory
 *   1 guess   the set F = rows violated at x0 (or with guess > 0)
 *   2 block   solve A_FF l_F = b_F by L L', refined through the slacks w; exchange all rows of the
 *     pivots  wrong sign (l_i < 0 leaves F, w_i < 0 enters) [JP94]; of rows within 60 degrees that
 *             are violated only the worst enters. Again while that leaves fewer wrong rows; about
 *             5 sets for 1000 rows. None wrong: done.
 *   3 finish  dual active set [GI83] from what F is worth (independent rows, l > 0), in arithmetic
 *             of 32 digits [D71]: the most violated row p enters along the direction d in which
 *             all of F stay equations, l += t d, d = (-A_FF^-1 A_Fp, 1): up to where p holds, or
 *             where some l_j = 0 and row j leaves F. Neither: d is a Farkas certificate.
 *   settle    the set found, once more in the common order: the bits are those of the set
 *
 * Why it ends: 2 stops after a few tries without a smaller number of wrong rows. In 3 each entry
 * raises the dual objective strictly, so no set comes twice, and between two entries rows only
 * leave. Why 3 has twice the digits: rows that stand off each other by the angle e put e^2 into A,
 * so that doubles see 1e-8, where contacts seen twice differ by less; the apex of such a wedge lies
 * 1/e times the rows' misfit away. Step 2 is believed only where every row that looks active stands
 * more than 1e-5 off the span of F (the square, DEPENDENT, is 1e-10): a twentieth of the time.
 * Rows nearer than 1e-13 (COPY) are one row; a ray shorter than that is a contradiction.
 *
 * Farkas: y >= 0 with G_free'y = 0 and y.(h - G_fixed x0) < 0 rules out any x: y.(G x) is both
 * y.(G_fixed x0) and at most y.h. It is checked on the rows as given before it is returned.
 *
 * Tried and lost: pivots of single rows by least index when block pivots stall (30 to 300 more
 * factors; step 3 needs 5 to 50 rows); all violated rows into F (four near copies of each contact:
 * block pivots stall from 50 rows on, 3000 rows take 450 ms instead of 3).
 *
 * [GI83] Goldfarb, Idnani, Math. Programming 27 (1983) 1-33. doi:10.1007/BF02591962
 * [JP94] Judice, Pires, Computers Ops Res. 21 (1994) 587-596. doi:10.1016/0305-0548(94)90106-6
 * [CM69] Cuthill, McKee, Proc. 24th ACM Conf. (1969) 157-172. doi:10.1145/800195.805928
 * [D71]  Dekker, Numer. Math. 18 (1971) 224-242. doi:10.1007/BF01397083
 * code   lambda l, w slack, act the set F, at a row's place in L, list its inverse; ..2: 32 digits
 * checked  tests/test_qp.c (closed forms, enumeration, public problems), tests/fuzz_qp.c;
 *          time: tests/bench/bench_qp.c
 */

#define CLOTHI_QP_COOKIE     0x0c107117u
#define CLOTHI_QP_ROUNDING   4.5e-16        /* two roundings                                   */
#define CLOTHI_QP_SMALL      1e-14          /* slack or multiplier, relative: as good as 0     */
#define CLOTHI_QP_DEPENDENT  1e-10          /* square of a row's distance from other rows      */
#define CLOTHI_QP_DEPENDENT2 1e-26          /* the same with twice the digits                  */
#define CLOTHI_QP_SMALL2     1e-19          /* slack with twice the digits: as good as 0       */
#define CLOTHI_QP_DRIFT2     1e-28          /* rounding of a slack, to the largest multiplier  */
#define CLOTHI_QP_START2     1e-18          /* rows nearer to others do not start the set      */
#define CLOTHI_QP_COPY       1e-13          /* distance of two rows that are one               */
#define CLOTHI_QP_CANCELLED  1e-24          /* square of the length of a row that is none      */
#define CLOTHI_QP_TINY       1e-290         /* keeps 0/0 away                                  */
#define CLOTHI_QP_PATIENCE   3              /* tries without fewer wrong rows                  */
#define CLOTHI_QP_PARALLEL   0.25           /* cosine squared: rows that stand for each other  */

/* ----- arithmetic with twice the digits ---------------------------------------------------- */

typedef struct clothi_qp_two {              /* the number hi + lo, |lo| <= ulp(hi) / 2         */
    double hi, lo;
} clothi_qp_two;

static inline clothi_qp_two clothi_qp_sum(double a, double b) {
    clothi_qp_two r;
    double        t;
    r.hi = a + b;
    t = r.hi - a;
    r.lo = (a - (r.hi - t)) + (b - t);
    return r;
}

/* a b exactly. Both ways give the same bits, and so does a compiler that contracts: every partial
 * product is exact. */
static inline clothi_qp_two clothi_qp_product(double a, double b) {
    clothi_qp_two r;
    r.hi = a * b;
#if defined(__FMA__)
    r.lo = fma(a, b, -r.hi);
#else
    {
        const double p = 134217729.0 * a, q = 134217729.0 * b;
        const double a1 = p - (p - a), b1 = q - (q - b), a2 = a - a1, b2 = b - b1;
        r.lo = ((a1 * b1 - r.hi) + a1 * b2 + a2 * b1) + a2 * b2;
    }
#endif
    return r;
}

static inline clothi_qp_two clothi_qp_make(double hi, double lo) {
    clothi_qp_two r;
    r.hi = hi + lo;
    r.lo = lo - (r.hi - hi);
    return r;
}

static inline clothi_qp_two clothi_qp_add(clothi_qp_two a, clothi_qp_two b) {
    const clothi_qp_two s = clothi_qp_sum(a.hi, b.hi), t = clothi_qp_sum(a.lo, b.lo);
    const clothi_qp_two u = clothi_qp_make(s.hi, s.lo + t.hi);
    return clothi_qp_make(u.hi, u.lo + t.lo);
}

static inline clothi_qp_two clothi_qp_mul(clothi_qp_two a, clothi_qp_two b) {
    const clothi_qp_two p = clothi_qp_product(a.hi, b.hi);
    return clothi_qp_make(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}

static inline clothi_qp_two clothi_qp_neg(clothi_qp_two a) {
    a.hi = -a.hi;
    a.lo = -a.lo;
    return a;
}

static inline clothi_qp_two clothi_qp_div(clothi_qp_two a, clothi_qp_two b) {
    clothi_qp_two q, one, two;
    q.hi = a.hi / b.hi;
    q.lo = 0;
    one = clothi_qp_add(a, clothi_qp_neg(clothi_qp_mul(q, b)));
    two = clothi_qp_make(q.hi, one.hi / b.hi);
    q = clothi_qp_add(one, clothi_qp_neg(clothi_qp_mul(clothi_qp_make(one.hi / b.hi, 0), b)));
    return clothi_qp_make(two.hi, two.lo + q.hi / b.hi);
}

static inline clothi_qp_two clothi_qp_root(clothi_qp_two a) {
    const double        s = sqrt(a.hi);
    const clothi_qp_two r = clothi_qp_add(a, clothi_qp_neg(clothi_qp_product(s, s)));
    return clothi_qp_make(s, 0.5 * r.hi / s);
}

/* s + a b */
static inline clothi_qp_two clothi_qp_axpy(clothi_qp_two s, clothi_qp_two a, double b) {
    const clothi_qp_two p = clothi_qp_product(a.hi, b), t = clothi_qp_sum(s.hi, p.hi);
    return clothi_qp_make(t.hi, t.lo + (s.lo + (p.lo + a.lo * b)));
}

/* s - a.b */
static clothi_qp_two clothi_qp_minus_dot2(clothi_qp_two s, const clothi_qp_two *a,
                                          const clothi_qp_two *b, int n) {
    double hi = s.hi, lo = s.lo;
    int    i;
    for (i = 0; i < n; i++) {
        const clothi_qp_two p = clothi_qp_product(a[i].hi, b[i].hi);
        const clothi_qp_two t = clothi_qp_sum(hi, -p.hi);
        hi = t.hi;
        lo += t.lo - (p.lo + (a[i].hi * b[i].lo + a[i].lo * b[i].hi));
    }
    return clothi_qp_make(hi, lo);
}

static double clothi_qp_minus_dot(double s, const double *CLOTHI_RESTRICT a,
                                  const double *CLOTHI_RESTRICT b, int n) {
    double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    int    i;
    for (i = 0; i + 4 <= n; i += 4) {
        s0 += a[i] * b[i];
        s1 += a[i + 1] * b[i + 1];
        s2 += a[i + 2] * b[i + 2];
        s3 += a[i + 3] * b[i + 3];
    }
    for (; i < n; i++) s0 += a[i] * b[i];
    return s - ((s0 + s1) + (s2 + s3));
}

/* ----- memory -------------------------------------------------------------------------------- */

enum {
    CLOTHI_QP_INTS, CLOTHI_QP_REALS, CLOTHI_QP_COLUMNS, CLOTHI_QP_SLOTS, CLOTHI_QP_A,
    CLOTHI_QP_A2, CLOTHI_QP_L, CLOTHI_QP_L2, CLOTHI_QP_TWOS, CLOTHI_QP_BUFFERS
};

struct cloth_qp_work {
    cloth_hooks hooks;
    void       *data[CLOTHI_QP_BUFFERS];
    size_t      size[CLOTHI_QP_BUFFERS];    /* bytes                                           */
};

CLOTH_API cloth_qp_options cloth_qp_options_default(void) {
    cloth_qp_options o;
    memset(&o, 0, sizeof o);
    o.cookie = CLOTHI_QP_COOKIE;
    o.tolerance = CLOTH_DEFAULT_QP_TOLERANCE;
    return o;
}

CLOTH_API cloth_status cloth_qp_work_create(const cloth_hooks *hooks, cloth_qp_work **out) {
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "out = NULL: pass an address");
    *out = (cloth_qp_work *)clothi_alloc(hooks, 1, sizeof **out);
    if (!*out) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for the work of a QP");
    if (hooks) (*out)->hooks = *hooks;
    return CLOTH_OK;
}

static void clothi_qp_work_clear(cloth_qp_work *work) {
    int k;
    for (k = 0; k < CLOTHI_QP_BUFFERS; k++) clothi_free(&work->hooks, work->data[k]);
}

CLOTH_API void cloth_qp_work_destroy(cloth_qp_work *work) {
    cloth_hooks hooks;
    if (!work) return;
    clothi_qp_work_clear(work);
    hooks = work->hooks;
    clothi_free(&hooks, work);
}

CLOTH_API size_t cloth_qp_work_bytes(const cloth_qp_work *work) {
    size_t bytes = clothi_block_size(work);
    int    k;
    for (k = 0; work && k < CLOTHI_QP_BUFFERS; k++) bytes += clothi_block_size(work->data[k]);
    return bytes;
}

/* A buffer of at least count * size bytes, the first `keep` of them as they were; NULL: no memory,
 * the old one stays. Grown by a quarter more than asked, so that similar solves fit. */
static void *clothi_qp_take(cloth_qp_work *work, int which, size_t count, size_t size,
                            size_t keep) {
    size_t bytes;
    void  *data;
    if (count > (size_t)-1 / 2 / size) return NULL;
    bytes = count * size;
    if (work->data[which] && bytes <= work->size[which]) return work->data[which];
    bytes += bytes / 4;
    data = clothi_alloc(&work->hooks, bytes, 1);
    if (!data) return NULL;
    if (keep) memcpy(data, work->data[which], keep);
    clothi_free(&work->hooks, work->data[which]);
    work->data[which] = data;
    work->size[which] = bytes;
    return data;
}

/* ----- the problem, scaled ------------------------------------------------------------------- */

/* Row i is divided by 2^exponent[i], so that a_ii lies in [1/4, 1): nothing is rounded. Everything
 * below speaks of the scaled rows and of their multipliers. */
typedef struct clothi_qp {
    const cloth_qp    *q;
    const cloth_hooks *hooks;               /* log and cancel                                  */
    cloth_qp_work     *work;
    int      m, n, k;                       /* rows, unknowns, rows of the factor              */
    int      dropped, iterations, most, factorizations, refactorizations;
    int     *keep;          /* [m] 1: a row with a free unknown, no copy of another            */
    int     *act;           /* [m] 1: in the set tried                                         */
    int     *at;            /* [m] place in the factor; -1: not in it; -2: it depends on others */
    int     *order;         /* [m] rows by place in the order of small profile                 */
    int     *list;          /* [m] rows of the factor                                          */
    int     *first;         /* [m] first column of each row of the factor                      */
    int     *mark;          /* [m]                                                             */
    int     *exponent;      /* [m]                                                             */
    int     *cstart;        /* [n+1] entries by column                                         */
    int     *crow, *centry; /* their rows, and their places in g                               */
    int     *astart;        /* [m+1] A = G minv G' by rows, both triangles                     */
    int     *acol;
    double  *aval, *adiag;
    size_t  *lstart;        /* [m+1] factor L: row i from column first[i] to i                 */
    double  *L;
    double  *g, *h;         /* scaled values, 0 where minv is 0; h - G_fixed x0_fixed          */
    double  *b;             /* [m] G x0 - h                                                    */
    double  *lambda, *w;    /* [m] multipliers, slack h - G x                                  */
    double  *size;          /* [m] |h| + sum |g| r, as in the report: the measure of rounding */
    double  *rhs;           /* [m]                                                             */
    double  *x, *u, *v;     /* [n]                                                             */
    clothi_qp_two *a2, *L2, *h2, *b2, *lambda2, *w2, *rhs2, *ray2, *x2, *u2;
} clothi_qp;

/* Slices of the blocks whose size is known beforehand. */
static int clothi_qp_layout(clothi_qp *s) {
    const size_t m = (size_t)s->m, n = (size_t)s->n, nz = (size_t)s->q->row[s->m];
    int    *i = (int *)clothi_qp_take(s->work, CLOTHI_QP_INTS, 9 * m + n + 2, sizeof(int), 0);
    double *d = (double *)clothi_qp_take(s->work, CLOTHI_QP_REALS, nz + 7 * m + 3 * n,
                                         sizeof(double), 0);
    int    *c = (int *)clothi_qp_take(s->work, CLOTHI_QP_COLUMNS, 2 * nz, sizeof(int), 0);
    s->lstart = (size_t *)clothi_qp_take(s->work, CLOTHI_QP_SLOTS, m + 1, sizeof(size_t), 0);
    if (!i || !d || !c || !s->lstart) return 0;
    s->keep = i, s->act = i + m, s->at = i + 2 * m, s->order = i + 3 * m, s->list = i + 4 * m;
    s->first = i + 5 * m, s->mark = i + 6 * m, s->exponent = i + 7 * m;
    s->astart = i + 8 * m, s->cstart = i + 9 * m + 1;
    s->crow = c, s->centry = c + nz;
    s->g = d, d += nz;
    s->h = d, s->b = d + m, s->lambda = d + 2 * m, s->w = d + 3 * m, s->size = d + 4 * m;
    s->rhs = d + 5 * m, s->adiag = d + 6 * m, s->x = d + 7 * m, s->u = s->x + n;
    s->v = s->u + n;
    return 1;
}

/* The exponent e of the row's length: sum minv g^2 = r 4^e, 1/4 <= r < 1; INT_MIN without one. */
static int clothi_qp_exponent(const cloth_qp *q, int i) {
    double sum = 0, big = 0;
    int    e, p;
    for (p = q->row[i]; p < q->row[i + 1]; p++) {
        const double a = q->val[p];
        sum += a * a * q->minv[q->col[p]];
    }
    if (sum > 1e-200 && sum < 1e200) {
        frexp(sum, &e);
        return (e + (e & 1)) / 2;
    }
    /* the square may be beyond the range of doubles, the length is not */
    for (p = q->row[i]; p < q->row[i + 1]; p++)
        big = clothi_max(big, fabs(q->val[p]) * sqrt(q->minv[q->col[p]]));
    if (!(big > 0) || !clothi_finite(big)) return big > 0 ? 0x7fffffff : -0x7fffffff;
    for (p = q->row[i], sum = 0; p < q->row[i + 1]; p++) {
        const double a = q->val[p] * sqrt(q->minv[q->col[p]]) / big;
        sum += a * a;
    }
    frexp(big * sqrt(sum), &e);
    return e;
}

/* Scales row i. 0: fine; 1: no free unknown and satisfied; 2: no free unknown and violated;
 * 3: its length is out of range. */
static int clothi_qp_scale_row(clothi_qp *s, int i) {
    const cloth_qp *q = s->q;
    const int       e = clothi_qp_exponent(q, i);
    const int       begin = q->row[i], end = q->row[i + 1];
    double          unit, h, size, free_x = 0;
    int             p;
    s->keep[i] = e > -0x7fffffff;
    s->exponent[i] = s->keep[i] ? e : 0;
    if (e > 1000 || (s->keep[i] && e < -1000)) return 3;
    unit = ldexp(1.0, -s->exponent[i]);
    h = q->h[i] * unit;
    size = fabs(h);
    for (p = begin; p < end; p++) {
        const int    c = q->col[p];
        const double a = q->val[p] * unit, t = a * q->x0[c];
        const int    fixed = !(q->minv[c] > 0);
        s->g[p] = fixed ? 0 : a;
        if (fixed) h -= t;
        else free_x += t;
        size += fabs(t);
    }
    s->h[i] = h;
    s->b[i] = free_x - h;
    s->size[i] = size;
    if (s->keep[i]) return clothi_finite(size) ? 0 : 3;
    return h < -CLOTHI_QP_SMALL * size ? 2 : 1;
}

/* Entries by column: free ones of the rows that are kept. */
static void clothi_qp_columns(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p, *start = s->cstart;
    memset(start, 0, ((size_t)s->n + 1) * sizeof *start);
    for (p = 0; p < q->row[s->m]; p++) start[q->col[p] + 1] += s->g[p] < 0 || s->g[p] > 0;
    for (i = 0; i < s->n; i++) start[i + 1] += start[i];
    for (i = 0; i < s->m; i++)
        for (p = q->row[i]; p < q->row[i + 1]; p++)
            if (s->g[p] < 0 || s->g[p] > 0) {
                const int to = start[q->col[p]]++;
                s->crow[to] = i;
                s->centry[to] = p;
            }
    memmove(start + 1, start, (size_t)s->n * sizeof *start);
    start[0] = 0;
}

/* A = G minv G'. */
static cloth_status clothi_qp_matrix(clothi_qp *s) {
    const cloth_qp *q = s->q;
    double          most = 0;
    int             i, p, f, nz = 0;
    for (i = 0; i < s->n; i++) {
        const double len = s->cstart[i + 1] - s->cstart[i];
        most += len * len;
    }
    most = clothi_min(most, (double)s->m * s->m);
    if (most > 2147483647.0)
        return clothi_fail(s->hooks, CLOTH_ERR_CAPACITY, "qp.m = %i: its rows share so many "
                           "unknowns that %g pairs of rows couple", s->m, most);
    s->aval = (double *)clothi_qp_take(s->work, CLOTHI_QP_A, (size_t)most + 1,
                                       sizeof(double) + sizeof(int), 0);
    if (!s->aval) return clothi_fail(s->hooks, CLOTH_ERR_MEMORY, "no memory for qp.m = %i", s->m);
    s->acol = (int *)(void *)(s->aval + (size_t)most);
    for (i = 0; i < s->m; i++) s->mark[i] = -1;
    for (i = 0; i < s->m; i++) {
        const int begin = s->astart[i] = nz;
        s->adiag[i] = 0;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int    c = q->col[p];
            const double t = s->g[p] * q->minv[c];
            if (!(t < 0 || t > 0)) continue;
            for (f = s->cstart[c]; f < s->cstart[c + 1]; f++) {
                const int j = s->crow[f];
                if (s->mark[j] < begin) {
                    s->mark[j] = nz;
                    s->acol[nz] = j;
                    s->aval[nz++] = 0;
                }
                s->aval[s->mark[j]] += t * s->g[s->centry[f]];
            }
        }
        if (nz > begin) s->adiag[i] = s->aval[s->mark[i]];
    }
    s->astart[s->m] = nz;
    return CLOTH_OK;
}

/* Of rows that are positive multiples of each other but for rounding, the tightest stays. */
static void clothi_qp_drop_copies(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p, e;
    memset(s->u, 0, (size_t)s->n * sizeof *s->u);
    for (i = 0; i < s->m; i++)
        for (e = s->astart[i]; e < s->astart[i + 1] && s->keep[i]; e++) {
            const int    j = s->acol[e];
            const double a = s->aval[e], t = a / s->adiag[j];
            double       far = 0;
            if (j >= i || !s->keep[j] || !(a > 0)) continue;
            if (a * a < (1 - 1e-6) * s->adiag[i] * s->adiag[j]) continue;
            for (p = q->row[i]; p < q->row[i + 1]; p++) s->u[q->col[p]] += s->g[p];
            for (p = q->row[j]; p < q->row[j + 1]; p++) s->u[q->col[p]] -= t * s->g[p];
            for (p = q->row[i]; p < q->row[i + 1]; p++) {
                far += s->u[q->col[p]] * s->u[q->col[p]] * q->minv[q->col[p]];
                s->u[q->col[p]] = 0;
            }
            for (p = q->row[j]; p < q->row[j + 1]; p++) {
                far += s->u[q->col[p]] * s->u[q->col[p]] * q->minv[q->col[p]];
                s->u[q->col[p]] = 0;
            }
            if (far > CLOTHI_QP_COPY * CLOTHI_QP_COPY * s->adiag[i]) continue;
            s->keep[s->b[i] > t * s->b[j] ? j : i] = 0;
            s->dropped++;
        }
}

/* ----- order --------------------------------------------------------------------------------- */

/* Breadth first from `root` over rows without a place, neighbours by rising degree; returns the
 * row visited last. visited: mark == stamp. */
static int clothi_qp_breadth(clothi_qp *s, int root, int begin, int stamp, int *end) {
    int head = begin, tail = begin, i, e;
    s->order[tail++] = root;
    s->mark[root] = stamp;
    while (head < tail) {
        const int r = s->order[head++], from = tail;
        for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
            const int j = s->acol[e], degree = s->astart[j + 1] - s->astart[j];
            if (s->mark[j] == stamp || !s->keep[j]) continue;
            s->mark[j] = stamp;
            for (i = tail++; i > from; i--) {
                const int o = s->order[i - 1];
                if (s->astart[o + 1] - s->astart[o] <= degree) break;
                s->order[i] = o;
            }
            s->order[i] = j;
        }
    }
    *end = tail;
    return s->order[tail - 1];
}

/* Reverse Cuthill-McKee [CM69] from a row at an end of each component: small profile. */
static void clothi_qp_order(clothi_qp *s) {
    int i, begin = 0, end = 0, stamp = -2, pass;
    for (i = 0; i < s->m; i++) s->mark[i] = -1;
    for (i = 0; i < s->m; i++) {
        int root = i;
        if (s->mark[i] != -1 || !s->keep[i]) continue;
        for (pass = 0; pass < 3; pass++) root = clothi_qp_breadth(s, root, begin, stamp--, &end);
        begin = end;
    }
    for (i = 0; i < end / 2; i++) {
        const int t = s->order[i];
        s->order[i] = s->order[end - 1 - i];
        s->order[end - 1 - i] = t;
    }
    for (i = 0; i < s->m; i++)
        if (!s->keep[i]) s->order[end++] = i;
}

/* ----- factor in doubles --------------------------------------------------------------------- */

/* Row s->k of the factor from row r; *first its first column. Returns the square of the pivot. */
static double clothi_qp_factor_row(clothi_qp *s, int r, double *row, int *first) {
    double pivot = s->adiag[r];
    int    e, j, k = s->k, low = k;
    for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
        const int at = s->at[s->acol[e]];
        if (at >= 0 && at < low) low = at;
    }
    memset(row, 0, (size_t)(k - low) * sizeof *row);
    for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
        const int at = s->at[s->acol[e]];
        if (at >= 0) row[at - low] = s->aval[e];
    }
    for (j = low; j < k; j++) {
        const double *other = s->L + s->lstart[j];
        const int     f = s->first[j], from = f > low ? f : low;
        row[j - low] = clothi_qp_minus_dot(row[j - low], row + (from - low), other + (from - f),
                                           j - from) / other[j - f];
        pivot -= row[j - low] * row[j - low];
    }
    *first = low;
    return pivot;
}

/* Factors the rows with act, in order; those that depend on rows before them get at = -2.
 * 0: no memory. */
static int clothi_qp_factor(clothi_qp *s) {
    size_t need = 1;
    int    p, i, e, k = 0;
    for (i = 0; i < s->m; i++) s->at[i] = -1;
    for (p = 0; p < s->m; p++) {            /* the profile, as if no row were left out */
        int low = k;
        i = s->order[p];
        if (!s->act[i]) continue;
        for (e = s->astart[i]; e < s->astart[i + 1]; e++) {
            const int at = s->at[s->acol[e]];
            if (at >= 0 && at < low) low = at;
        }
        s->at[i] = k++;
        need += (size_t)(k - low);
    }
    s->L = (double *)clothi_qp_take(s->work, CLOTHI_QP_L, need, sizeof(double), 0);
    if (!s->L) return 0;
    for (i = 0; i < s->m; i++) s->at[i] = -1;
    s->k = 0;
    s->lstart[0] = 0;
    s->factorizations++;
    for (p = 0; p < s->m; p++) {
        double *row = s->L + s->lstart[s->k], pivot;
        i = s->order[p];
        if (!s->act[i]) continue;
        pivot = clothi_qp_factor_row(s, i, row, s->first + s->k);
        if (!(pivot > CLOTHI_QP_DEPENDENT * s->adiag[i])) {
            s->at[i] = -2;
            continue;
        }
        row[s->k - s->first[s->k]] = sqrt(pivot);
        s->list[s->k] = i;
        s->at[i] = s->k;
        s->lstart[s->k + 1] = s->lstart[s->k] + (size_t)(s->k - s->first[s->k] + 1);
        s->k++;
    }
    return 1;
}

/* y [k] becomes (L L')^-1 y. */
static void clothi_qp_back(const clothi_qp *s, double *y) {
    int i, j;
    for (i = 0; i < s->k; i++) {
        const double *row = s->L + s->lstart[i];
        const int     f = s->first[i];
        y[i] = clothi_qp_minus_dot(y[i], row, y + f, i - f) / row[i - f];
    }
    for (i = s->k - 1; i >= 0; i--) {
        const double *row = s->L + s->lstart[i];
        const int     f = s->first[i];
        const double  t = y[i] /= row[i - f];
        for (j = f; j < i; j++) y[j] -= t * row[j - f];
    }
}

/* v [n], minv |G'| lambda before: the sizes of the numbers that each x was made of, at most the
 * largest |x| or |x0|. */
static void clothi_qp_sizes(const cloth_qp *q, const double *x, double *v) {
    double big = 0;
    int    i;
    for (i = 0; i < q->n; i++) big = clothi_max(big, clothi_max(fabs(x[i]), fabs(q->x0[i])));
    for (i = 0; i < q->n; i++)
        v[i] = clothi_max(clothi_min(v[i], big), clothi_max(fabs(x[i]), fabs(q->x0[i])));
}

/* x = x0 - minv G' lambda, slack w = h - G x, and what their rounding is measured by. */
static void clothi_qp_slacks(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p;
    memset(s->u, 0, 2 * (size_t)s->n * sizeof *s->u);           /* and v */
    for (i = 0; i < s->m; i++) {
        const double l = s->lambda[i];
        if (!(l < 0 || l > 0)) continue;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            s->u[q->col[p]] += l * s->g[p];
            s->v[q->col[p]] += fabs(l * s->g[p]);
        }
    }
    for (i = 0; i < s->n; i++) {
        s->x[i] = q->x0[i] - q->minv[i] * s->u[i];
        s->v[i] *= q->minv[i];
    }
    clothi_qp_sizes(q, s->x, s->v);
    for (i = 0; i < s->m; i++) {
        double sum = s->h[i], size = fabs(sum) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            sum -= s->g[p] * s->x[q->col[p]];
            size += fabs(s->g[p]) * s->v[q->col[p]];
        }
        s->w[i] = sum;
        s->size[i] = size;
    }
}

/* ----- block pivoting ------------------------------------------------------------------------ */

/* Solves the equations of the factored rows; refines until their slacks are rounding. */
static int clothi_qp_equations(clothi_qp *s) {
    double before = CLOTHI_HUGE;
    int    i, pass;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    for (i = 0; i < s->k; i++) s->rhs[i] = s->b[s->list[i]];
    for (pass = 0; pass < 6; pass++) {
        double worst = 0;
        clothi_qp_back(s, s->rhs);
        for (i = 0; i < s->k; i++) s->lambda[s->list[i]] += s->rhs[i];
        clothi_qp_slacks(s);
        for (i = 0; i < s->k; i++) {
            const int r = s->list[i];
            s->rhs[i] = -s->w[r];
            worst = clothi_max(worst, fabs(s->w[r]) / s->size[r]);
        }
        if (!(worst < before)) return worst <= CLOTHI_QP_SMALL;
        if (worst <= CLOTHI_QP_ROUNDING) return 1;
        before = 0.5 * worst;
    }
    return before <= 0.5 * CLOTHI_QP_SMALL;
}

typedef struct clothi_qp_wrong {            /* rows on the wrong side of complementarity       */
    int count;
    int stuck;                              /* violated rows that depend on the factored ones  */
} clothi_qp_wrong;

static clothi_qp_wrong clothi_qp_judge(clothi_qp *s) {
    clothi_qp_wrong bad = {0, 0};
    double          big = 0;
    int             i, wrong;
    for (i = 0; i < s->m; i++) big = clothi_max(big, fabs(s->lambda[i]));
    for (i = 0; i < s->m; i++) {
        s->mark[i] = 0;
        if (!s->keep[i]) continue;
        wrong = s->at[i] >= 0 ? s->lambda[i] < -CLOTHI_QP_SMALL * big
                              : s->w[i] < -CLOTHI_QP_SMALL * s->size[i];
        if (wrong && s->at[i] == -2) bad.stuck++;
        else if (wrong) {
            s->mark[i] = 1;
            bad.count++;
        }
    }
    return bad;
}

/* A row outside the factor that looks active must stand well off the span of the factored rows,
 * or it decides where x lies by less than its slack is known to. */
static int clothi_qp_doubtful(clothi_qp *s) {
    double *y = s->rhs;
    int     i, j, e;
    for (i = 0; i < s->m; i++) {
        double pivot = s->adiag[i];
        int    low = s->k;
        if (!s->keep[i] || s->at[i] >= 0 || s->w[i] > CLOTHI_QP_SMALL * s->size[i]) continue;
        if (s->at[i] == -2) return 1;
        memset(y, 0, (size_t)s->k * sizeof *y);
        for (e = s->astart[i]; e < s->astart[i + 1]; e++) {
            const int at = s->at[s->acol[e]];
            if (at >= 0) y[at] = s->aval[e];
            if (at >= 0 && at < low) low = at;
        }
        for (j = low; j < s->k; j++) {
            const double *row = s->L + s->lstart[j];
            const int     f = s->first[j], from = f > low ? f : low;
            y[j] = clothi_qp_minus_dot(y[j], row + (from - f), y + from, j - from) / row[j - f];
            pivot -= y[j] * y[j];
        }
        if (!(pivot > CLOTHI_QP_DEPENDENT * s->adiag[i])) return 1;
    }
    return 0;
}

/* Multipliers that are 0 but for rounding become 0. */
static void clothi_qp_clamp(clothi_qp *s) {
    int i, any = 0;
    for (i = 0; i < s->m; i++)
        if (s->lambda[i] < 0) {
            s->lambda[i] = 0;
            any = 1;
        }
    if (any) clothi_qp_slacks(s);
}

/* Is a row that points much the same way violated more? w: slacks. */
static int clothi_qp_shadowed(const clothi_qp *s, int i, const double *w) {
    const double mine = w[i] * fabs(w[i]) / s->adiag[i];
    int          e;
    for (e = s->astart[i]; e < s->astart[i + 1]; e++) {
        const int    j = s->acol[e];
        const double a = s->aval[e];
        double       other;
        if (!(a > 0) || j == i || !s->keep[j] || !(w[j] < 0)) continue;
        if (a * a < CLOTHI_QP_PARALLEL * s->adiag[i] * s->adiag[j]) continue;
        other = w[j] * fabs(w[j]) / s->adiag[j];
        if (other < mine || (j < i && !(other > mine))) return 1;
    }
    return 0;
}

/* Exchanges all rows on the wrong side at once as long as that lowers their number, or has done so
 * within the last few tries. done: the optimum is in x and lambda; else act is where to go on. */
static cloth_status clothi_qp_pivot(clothi_qp *s, int *done) {
    int best = s->m + 1, patience = CLOTHI_QP_PATIENCE, i;
    *done = 0;
    while (s->iterations < s->most) {
        clothi_qp_wrong bad;
        int             exact;
        if (s->hooks->cancel.fn && s->hooks->cancel.fn(s->hooks->cancel.user))
            return CLOTH_ERR_CANCELLED;
        s->iterations++;
        if (!clothi_qp_factor(s)) return CLOTH_ERR_MEMORY;
        exact = clothi_qp_equations(s);
        bad = clothi_qp_judge(s);
        if (bad.count == 0) {
            *done = !bad.stuck && exact && !clothi_qp_doubtful(s);
            if (*done) clothi_qp_clamp(s);
            break;
        }
        patience = bad.count < best ? CLOTHI_QP_PATIENCE : patience - 1;
        if (bad.count < best) best = bad.count;
        if (patience < 0) break;
        for (i = 0; i < s->m; i++)
            if (s->mark[i]) s->act[i] = s->at[i] < 0 && !clothi_qp_shadowed(s, i, s->w);
    }
    return CLOTH_OK;
}

/* ----- the dual active set, with twice the digits -------------------------------------------- */

static int clothi_qp_start2(clothi_qp *s) {
    const size_t    m = (size_t)s->m, n = (size_t)s->n;
    const cloth_qp *q = s->q;
    clothi_qp_two  *t = (clothi_qp_two *)clothi_qp_take(s->work, CLOTHI_QP_TWOS, 6 * m + 2 * n,
                                                        sizeof *t, 0);
    int             i, e, p, f;
    s->a2 = (clothi_qp_two *)clothi_qp_take(s->work, CLOTHI_QP_A2, (size_t)s->astart[m] + 1,
                                            sizeof *t, 0);
    if (!t || !s->a2) return 0;
    s->h2 = t, s->b2 = t + m, s->lambda2 = t + 2 * m, s->w2 = t + 3 * m, s->rhs2 = t + 4 * m;
    s->ray2 = t + 5 * m, s->x2 = t + 6 * m, s->u2 = s->x2 + n;
    memset(s->a2, 0, (size_t)s->astart[m] * sizeof *t);
    for (i = 0; i < s->m; i++) {
        const double unit = ldexp(1.0, -s->exponent[i]);
        for (e = s->astart[i]; e < s->astart[i + 1]; e++) s->mark[s->acol[e]] = e;
        s->h2[i] = clothi_qp_make(q->h[i] * unit, 0);
        s->b2[i] = clothi_qp_make(0, 0);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int           c = q->col[p];
            const double        a = s->g[p];
            const clothi_qp_two t2 = clothi_qp_product(a, q->minv[c]);
            if (!(q->minv[c] > 0))
                s->h2[i] = clothi_qp_add(s->h2[i],
                                         clothi_qp_product(-q->val[p] * unit, q->x0[c]));
            if (!(a < 0 || a > 0)) continue;
            s->b2[i] = clothi_qp_add(s->b2[i], clothi_qp_product(a, q->x0[c]));
            for (f = s->cstart[c]; f < s->cstart[c + 1]; f++) {
                clothi_qp_two *to = s->a2 + s->mark[s->crow[f]];
                *to = clothi_qp_axpy(*to, t2, s->g[s->centry[f]]);
            }
        }
        s->b2[i] = clothi_qp_add(s->b2[i], clothi_qp_neg(s->h2[i]));
        s->mark[i] = i;
    }
    return 1;
}

/* a_ii with twice the digits. */
static clothi_qp_two clothi_qp_diagonal2(const clothi_qp *s, int i) {
    int e = s->astart[i];
    while (s->acol[e] != i) e++;
    return s->a2[e];
}

/* rhs2 = L^-1 (column of row r); returns what is left of a_rr; *low the first entry not 0. */
static clothi_qp_two clothi_qp_reduce2(clothi_qp *s, int r, clothi_qp_two *y, int *low) {
    clothi_qp_two pivot = clothi_qp_diagonal2(s, r);
    int           e, j, at, k = s->k;
    for (*low = k, e = s->astart[r]; e < s->astart[r + 1]; e++) {
        at = s->at[s->acol[e]];
        if (at >= 0 && at < *low) *low = at;
    }
    memset(y + *low, 0, (size_t)(k - *low) * sizeof *y);
    for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
        at = s->at[s->acol[e]];
        if (at >= 0 && at < k) y[at] = s->a2[e];
    }
    for (j = *low; j < k; j++) {
        const clothi_qp_two *row = s->L2 + s->lstart[j];
        const int            f = s->first[j], from = f > *low ? f : *low;
        y[j] = clothi_qp_div(clothi_qp_minus_dot2(y[j], row + (from - f), y + from, j - from),
                             row[j - f]);
    }
    return clothi_qp_minus_dot2(pivot, y + *low, y + *low, k - *low);
}

/* Row r becomes the last of the factor, unless the square of its distance from the others is at
 * most `least` of its length: 0. -1: no memory. */
static int clothi_qp_append2(clothi_qp *s, int r, double least) {
    const size_t  used = s->lstart[s->k];
    clothi_qp_two pivot;
    int           low;
    s->at[r] = -1;
    pivot = clothi_qp_reduce2(s, r, s->rhs2, &low);
    if (!(pivot.hi > least * s->adiag[r])) {
        s->at[r] = -2;
        return 0;
    }
    s->L2 = (clothi_qp_two *)clothi_qp_take(s->work, CLOTHI_QP_L2,
                                            used + (size_t)(s->k - low + 1), sizeof *s->L2,
                                            used * sizeof *s->L2);
    if (!s->L2) return -1;
    memcpy(s->L2 + used, s->rhs2 + low, (size_t)(s->k - low) * sizeof *s->L2);
    s->L2[used + (size_t)(s->k - low)] = clothi_qp_root(pivot);
    s->first[s->k] = low;
    s->list[s->k] = r;
    s->at[r] = s->k++;
    s->lstart[s->k] = used + (size_t)(s->k - low);
    return 1;
}

/* y [k] becomes L^-T y. */
static void clothi_qp_upper2(const clothi_qp *s, clothi_qp_two *y) {
    int i, j;
    for (i = s->k - 1; i >= 0; i--) {
        const clothi_qp_two *row = s->L2 + s->lstart[i];
        const int            f = s->first[i];
        const clothi_qp_two  t = clothi_qp_neg(y[i] = clothi_qp_div(y[i], row[i - f]));
        for (j = f; j < i; j++) y[j] = clothi_qp_add(y[j], clothi_qp_mul(t, row[j - f]));
    }
}

/* lambda2 of the factored rows from their equations, of all others 0. */
static void clothi_qp_equations2(clothi_qp *s) {
    clothi_qp_two *y = s->rhs2;
    int            i;
    for (i = 0; i < s->k; i++) {
        const clothi_qp_two *row = s->L2 + s->lstart[i];
        const int            f = s->first[i];
        y[i] = clothi_qp_div(clothi_qp_minus_dot2(s->b2[s->list[i]], row, y + f, i - f),
                             row[i - f]);
    }
    clothi_qp_upper2(s, y);
    memset(s->lambda2, 0, (size_t)s->m * sizeof *s->lambda2);
    for (i = 0; i < s->k; i++) s->lambda2[s->list[i]] = y[i];
}

/* Takes row number p out of the factor; rows behind it are factored again. 0: no memory. */
static int clothi_qp_remove2(clothi_qp *s, int p) {
    const int end = s->k;
    int       i;
    s->at[s->list[p]] = -1;
    for (i = p + 1; i < end; i++) s->at[s->list[i]] = -1;
    s->k = p;
    s->refactorizations++;
    for (i = p + 1; i < end; i++)
        if (clothi_qp_append2(s, s->list[i], CLOTHI_QP_DEPENDENT2) < 0) return 0;
    return 1;
}

/* Factors the rows with act in order. 0: no memory. */
static int clothi_qp_factor2(clothi_qp *s, double least) {
    int i, p;
    for (i = 0; i < s->m; i++) s->at[i] = -1;
    s->k = 0;
    s->lstart[0] = 0;
    s->factorizations++;
    for (p = 0; p < s->m; p++)
        if (s->act[s->order[p]] && clothi_qp_append2(s, s->order[p], least) < 0) return 0;
    return 1;
}

/* The rows with act, thinned until they are independent and their multipliers not negative. */
static int clothi_qp_thin2(clothi_qp *s) {
    int i, again = 1;
    while (again) {
        if (!clothi_qp_factor2(s, CLOTHI_QP_START2)) return 0;
        clothi_qp_equations2(s);
        for (i = 0, again = 0; i < s->m; i++) {
            if (s->at[i] >= 0 && s->lambda2[i].hi < 0) again = 1;
            s->act[i] = s->at[i] >= 0 && !(s->lambda2[i].hi < 0);
        }
    }
    return 1;
}

static void clothi_qp_slacks2(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p;
    memset(s->u2, 0, (size_t)s->n * sizeof *s->u2);
    for (i = 0; i < s->m; i++) {
        if (!(s->lambda2[i].hi > 0)) continue;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            clothi_qp_two *u = s->u2 + q->col[p];
            *u = clothi_qp_axpy(*u, s->lambda2[i], s->g[p]);
        }
    }
    for (i = 0; i < s->n; i++)
        s->x2[i] = clothi_qp_axpy(clothi_qp_make(q->x0[i], 0), s->u2[i], -q->minv[i]);
    for (i = 0; i < s->m; i++) {
        clothi_qp_two sum = s->h2[i];
        double        size = fabs(sum.hi) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int c = q->col[p];
            sum = clothi_qp_axpy(sum, s->x2[c], -s->g[p]);
            size += fabs(s->g[p]) * clothi_max(fabs(s->x2[c].hi), fabs(q->x0[c]));
        }
        s->w2[i] = sum;
        s->size[i] = size;
    }
}

/* The row that is violated most, -1: none. mark[i] == -3: its violation is rounding of the rows
 * that it depends on. */
static int clothi_qp_worst2(const clothi_qp *s) {
    double most = 0, big = 0;
    int    i, worst = -1;
    for (i = 0; i < s->m; i++) big = clothi_max(big, s->lambda2[i].hi);
    for (i = 0; i < s->m; i++) {
        const double v = -s->w2[i].hi;
        if (!s->keep[i] || s->at[i] >= 0 || s->mark[i] == -3) continue;
        if (!(v > CLOTHI_QP_SMALL2 * s->size[i] + CLOTHI_QP_DRIFT2 * big)) continue;
        if (v > most * sqrt(s->adiag[i])) {
            most = v / sqrt(s->adiag[i]);
            worst = i;
        }
    }
    return worst;
}

/* The largest a_ii y_i^2 of the ray y: what the length of G' y is measured by. */
static double clothi_qp_ray_size(const clothi_qp *s, int p) {
    double big = s->adiag[p];
    int    i;
    for (i = 0; i < s->k; i++) {
        const double y = s->ray2[i].hi;
        big = clothi_max(big, y * y * s->adiag[s->list[i]]);
    }
    return big;
}

/* Brings row p in: along the direction in which the factored rows stay equations, lambda_p grows
 * until p holds, or until a multiplier is 0 and its row leaves. CLOTH_OK; *ray: no end to it, ray2
 * (factored rows) and 1 for p are the certificate. */
static cloth_status clothi_qp_bring2(clothi_qp *s, int p, int *ray) {
    clothi_qp_two v = clothi_qp_neg(s->w2[p]), mine = clothi_qp_make(0, 0);
    const double  rounding = CLOTHI_QP_COPY * s->size[p];
    int           i, low, leave;
    for (*ray = 0;;) {
        clothi_qp_two *r = s->ray2, pivot, t = clothi_qp_make(CLOTHI_HUGE, 0);
        int            free_step;
        s->at[p] = -1;
        pivot = clothi_qp_reduce2(s, p, r, &low);
        memset(r, 0, (size_t)low * sizeof *r);
        clothi_qp_upper2(s, r);
        free_step = pivot.hi > CLOTHI_QP_DEPENDENT2 * s->adiag[p];
        if (!free_step && v.hi <= rounding && !(mine.hi > 0)) {
            s->mark[p] = -3;
            return CLOTH_OK;
        }
        if (free_step) t = clothi_qp_div(v, pivot);
        for (i = 0, leave = -1; i < s->k; i++) {
            clothi_qp_two q;
            if (!(r[i].hi > CLOTHI_QP_SMALL2)) continue;
            q = clothi_qp_div(s->lambda2[s->list[i]], r[i]);
            if (q.hi < t.hi) t = q, leave = i;
        }
        if (leave < 0 && !(pivot.hi > CLOTHI_QP_DEPENDENT2 * clothi_qp_ray_size(s, p))) {
            *ray = 1;
            return CLOTH_OK;
        }
        for (i = 0; i < s->k; i++) {
            clothi_qp_two *l = s->lambda2 + s->list[i];
            *l = clothi_qp_add(*l, clothi_qp_neg(clothi_qp_mul(t, r[i])));
            if (l->hi < 0) *l = clothi_qp_make(0, 0);
        }
        mine = clothi_qp_add(mine, t);
        if (free_step) v = clothi_qp_add(v, clothi_qp_neg(clothi_qp_mul(t, pivot)));
        if (leave < 0) break;
        s->lambda2[s->list[leave]] = clothi_qp_make(0, 0);
        if (!clothi_qp_remove2(s, leave)) return CLOTH_ERR_MEMORY;
    }
    if (clothi_qp_append2(s, p, CLOTHI_QP_DEPENDENT2) < 0) return CLOTH_ERR_MEMORY;
    clothi_qp_equations2(s);                /* from the equations: no drift over the steps */
    for (i = 0; i < s->k; i++)
        if (s->lambda2[s->list[i]].hi < 0) s->lambda2[s->list[i]] = clothi_qp_make(0, 0);
    return CLOTH_OK;
}

/* lambda = the certificate, of the rows as given, the largest 1. */
static void clothi_qp_certificate(clothi_qp *s, int p) {
    int i, e = s->exponent[p];
    double big = 0;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    for (i = 0; i < s->k; i++) {
        const int r = s->list[i];
        if (s->ray2[i].hi < 0) s->lambda[r] = ldexp(-s->ray2[i].hi, e - s->exponent[r]);
    }
    s->lambda[p] = 1;
    for (i = 0; i < s->m; i++) big = clothi_max(big, s->lambda[i]);
    for (i = 0; i < s->m; i++) s->lambda[i] /= big;
}

/* Is lambda a proof? u [n] is scratch. */
static int clothi_qp_is_certificate(const cloth_qp *q, const double *lambda, double *u,
                                    cloth_qp_report *rep) {
    double big = 0, sum = 0, size = 0, off = 0;
    int    i, p;
    memset(u, 0, (size_t)q->n * sizeof *u);
    for (i = 0; i < q->m; i++) {
        sum += lambda[i] * q->h[i];
        size += lambda[i] * fabs(q->h[i]);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int    c = q->col[p];
            const double f = q->val[p] * lambda[i], t = f * q->x0[c];
            big = clothi_max(big, fabs(q->val[p]));
            if (q->minv[c] > 0) u[c] += f;
            else {
                sum -= t;
                size += fabs(t);
            }
        }
    }
    for (i = 0; i < q->n; i++) off = clothi_max(off, fabs(u[i]));
    rep->certificate = sum;
    return off <= 1e-10 * big && sum < -CLOTHI_QP_SMALL * size;
}

/* Once more in the common order, so that the bits depend on the set and not on the way to it;
 * unless the rows are too dependent for another order. In doubles where these are enough: so it
 * would have ended, had block pivoting found the set. */
static cloth_status clothi_qp_settle2(clothi_qp *s, int solved) {
    int i, kept = 1;
    memcpy(s->ray2, s->lambda2, (size_t)s->m * sizeof *s->ray2);
    for (i = 0; i < s->m; i++) s->act[i] = s->lambda2[i].hi > 0;
    if (!clothi_qp_factor(s)) return CLOTH_ERR_MEMORY;
    if (solved && clothi_qp_equations(s) && clothi_qp_judge(s).count == 0 &&
        !clothi_qp_doubtful(s)) {
        clothi_qp_clamp(s);
        return CLOTH_OK;
    }
    if (!clothi_qp_factor2(s, CLOTHI_QP_DEPENDENT2)) return CLOTH_ERR_MEMORY;
    clothi_qp_equations2(s);
    for (i = 0; i < s->m; i++)
        if (s->act[i] && (s->at[i] < 0 || s->lambda2[i].hi < 0)) kept = 0;
    if (!kept) memcpy(s->lambda2, s->ray2, (size_t)s->m * sizeof *s->ray2);
    clothi_qp_slacks2(s);
    for (i = 0; i < s->m; i++) s->lambda[i] = s->lambda2[i].hi;
    for (i = 0; i < s->n; i++) s->x[i] = s->x2[i].hi;
    return CLOTH_OK;
}

/* Goldfarb and Idnani's method from the rows with act. */
static cloth_status clothi_qp_active_set(clothi_qp *s, cloth_qp_outcome *outcome,
                                         cloth_qp_report *rep) {
    cloth_status status;
    int          i, p, ray;
    *outcome = CLOTH_QP_MAX_ITERATIONS;
    if (!clothi_qp_start2(s) || !clothi_qp_thin2(s)) return CLOTH_ERR_MEMORY;
    for (i = 0; i < s->m; i++) s->mark[i] = 0;
    for (;;) {
        if (s->hooks->cancel.fn && s->hooks->cancel.fn(s->hooks->cancel.user))
            return CLOTH_ERR_CANCELLED;
        clothi_qp_slacks2(s);
        p = clothi_qp_worst2(s);
        if (p < 0) *outcome = CLOTH_QP_SOLVED;
        if (p < 0 || s->iterations >= s->most) break;
        s->iterations++;
        status = clothi_qp_bring2(s, p, &ray);
        if (status) return status;
        if (!ray) continue;
        *outcome = CLOTH_QP_INFEASIBLE;
        clothi_qp_certificate(s, p);
        if (clothi_qp_is_certificate(s->q, s->lambda, s->u, rep)) return CLOTH_OK;
        /* violated by no more than the rounding of rows that almost contradict it: left out; what
         * that does to the solution, the residual tells */
        *outcome = CLOTH_QP_MAX_ITERATIONS;
        s->mark[p] = -3;
        for (i = 0; i < s->m; i++) s->act[i] = s->at[i] >= 0;
        if (!clothi_qp_thin2(s)) return CLOTH_ERR_MEMORY;
    }
    return clothi_qp_settle2(s, *outcome == CLOTH_QP_SOLVED);
}

/* ----- the call ------------------------------------------------------------------------------ */

/* Residuals of x and lambda as returned, from the rows as given. u [n] and v [n] are scratch. */
static void clothi_qp_residuals(const cloth_qp *q, const double *x, const double *lambda,
                                double *u, double *v, cloth_qp_report *rep) {
    int i, p, overflow = 0;
    memset(u, 0, (size_t)q->n * sizeof *u);
    memset(v, 0, (size_t)q->n * sizeof *v);
    for (i = 0; i < q->m; i++)
        for (p = q->row[i]; p < q->row[i + 1] && lambda[i] > 0; p++) {
            u[q->col[p]] += q->val[p] * lambda[i];
            v[q->col[p]] += fabs(q->val[p] * lambda[i]);
        }
    for (i = 0; i < q->n; i++) {
        const double d = x[i] - q->x0[i], m = q->minv[i];
        const double size = clothi_max(m * v[i], clothi_max(fabs(x[i]), fabs(q->x0[i])));
        v[i] *= m;
        if (size > 0) rep->dual = clothi_max(rep->dual, fabs(d + m * u[i]) / size);
        if (m > 0) rep->objective += 0.5 * d * d / m;
        if (!clothi_finite(d + m * u[i]) || !clothi_finite(size)) overflow = 1;
    }
    clothi_qp_sizes(q, x, v);
    for (i = 0; i < q->m; i++) {
        double sum = q->h[i], size = fabs(sum) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            sum -= q->val[p] * x[q->col[p]];
            size += fabs(q->val[p]) * v[q->col[p]];
        }
        rep->primal = clothi_max(rep->primal, -sum / size);
        if (!clothi_finite(sum) || !clothi_finite(size)) overflow = 1;
        if (lambda[i] > 0) {
            rep->complementarity = clothi_max(rep->complementarity, fabs(sum) / size);
            rep->active++;
        }
    }
    rep->residual = clothi_max(rep->primal, clothi_max(rep->dual, rep->complementarity));
    if (overflow) rep->primal = rep->residual = CLOTHI_HUGE;
}

static cloth_status clothi_qp_check_numbers(const cloth_hooks *hooks, const char *name,
                                            const double *a, int n) {
    const ptrdiff_t i = clothi_find_nonfinite(a, (size_t)n);
    if (i < 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "qp.%s[%i] = %g: give it a number", name,
                       (int)i, a[i]);
}

static cloth_status clothi_qp_check(const cloth_hooks *hooks, const cloth_qp *q) {
    cloth_status status;
    int          i, nz;
    if (!q) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp = NULL: pass a problem");
    if (q->n < 1 || q->n > 0x3fffffff)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.n = %i: give it 1 .. 2^30 unknowns",
                           q->n);
    if (q->m < 0 || q->m > 0x0fffffff)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.m = %i: give it 0 .. 2^28 rows", q->m);
    if (!q->minv || !q->x0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.%s = NULL", q->minv ? "x0" : "minv");
    if (q->m && (!q->row || !q->col || !q->val || !q->h))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.%s = NULL",
                           !q->row ? "row" : !q->col ? "col" : !q->val ? "val" : "h");
    if ((status = clothi_qp_check_numbers(hooks, "minv", q->minv, q->n)) != CLOTH_OK ||
        (status = clothi_qp_check_numbers(hooks, "x0", q->x0, q->n)) != CLOTH_OK)
        return status;
    for (i = 0; i < q->n; i++)
        if (q->minv[i] < 0)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.minv[%i] = %g: an inverse mass is "
                               "not negative", i, q->minv[i]);
    if (!q->m) return CLOTH_OK;
    if (q->row[0] != 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.row[0] = %i: it is 0", q->row[0]);
    for (i = 0; i < q->m; i++)
        if (q->row[i + 1] < q->row[i])
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.row[%i] = %i but qp.row[%i] = %i",
                               i + 1, q->row[i + 1], i, q->row[i]);
    nz = q->row[q->m];
    for (i = 0; i < nz; i++)
        if (q->col[i] < 0 || q->col[i] >= q->n)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.col[%i] = %i but qp.n = %i", i,
                               q->col[i], q->n);
    if ((status = clothi_qp_check_numbers(hooks, "val", q->val, nz)) != CLOTH_OK) return status;
    return clothi_qp_check_numbers(hooks, "h", q->h, q->m);
}

/* Scales the rows; a violated row without a free unknown ends the matter: *violated = its row. */
static cloth_status clothi_qp_scale(clothi_qp *s, int *violated) {
    int i;
    *violated = -1;
    for (i = 0; i < s->m; i++) {
        const int what = clothi_qp_scale_row(s, i);
        if (what == 3)
            return clothi_fail(s->hooks, CLOTH_ERR_ARGUMENT, "qp row %i: |row| or |h| in units of "
                               "its unknowns is out of range (h = %g)", i, s->q->h[i]);
        s->dropped += what == 1;
        if (what == 2 && *violated < 0) *violated = i;
    }
    return CLOTH_OK;
}

/* From the scaled rows back to those given, and the report. */
static void clothi_qp_finish(clothi_qp *s, cloth_qp_outcome outcome, cloth_qp_report *rep) {
    int i;
    rep->outcome = outcome;
    rep->primal = rep->dual = rep->complementarity = rep->residual = rep->objective = 0;
    rep->certificate = 0;
    rep->active = 0;
    if (outcome == CLOTH_QP_INFEASIBLE) {
        if (!clothi_qp_is_certificate(s->q, s->lambda, s->u, rep))
            rep->outcome = CLOTH_QP_MAX_ITERATIONS;
        memcpy(s->x, s->q->x0, (size_t)s->n * sizeof *s->x);
        return;
    }
    for (i = 0; i < s->m; i++) s->lambda[i] = ldexp(s->lambda[i], -s->exponent[i]);
    clothi_qp_residuals(s->q, s->x, s->lambda, s->u, s->v, rep);
}

/* Neither solved nor proved infeasible: multipliers that grew without end may be the proof. */
static void clothi_qp_diverged(clothi_qp *s, cloth_qp_report *rep) {
    double big = 0;
    int    i;
    for (i = 0; i < s->m; i++) big = clothi_max(big, s->lambda[i]);
    for (i = 0; i < s->m; i++) s->w[i] = big > 0 ? s->lambda[i] / big : 0;
    if (clothi_qp_is_certificate(s->q, s->w, s->u, rep)) {
        memcpy(s->lambda, s->w, (size_t)s->m * sizeof *s->w);
        clothi_qp_finish(s, CLOTH_QP_INFEASIBLE, rep);
    } else
        rep->certificate = 0;
}

static cloth_status clothi_qp_run(clothi_qp *s, const cloth_qp_options *o, cloth_qp_report *rep) {
    cloth_status status;
    int          i, done = 0, violated;
    if (!clothi_qp_layout(s))
        return clothi_fail(s->hooks, CLOTH_ERR_MEMORY, "no memory for qp.m = %i", s->m);
    status = clothi_qp_scale(s, &violated);
    if (status) return status;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    if (violated < 0) {
        clothi_qp_columns(s);
        status = clothi_qp_matrix(s);
        if (status) return status;
        for (i = 0; i < s->m; i++)          /* entries of one column that cancel */
            if (s->keep[i] && !(s->adiag[i] > CLOTHI_QP_CANCELLED)) {
                s->keep[i] = 0;
                s->dropped++;
                if (s->b[i] > CLOTHI_QP_COPY * s->size[i]) violated = i;
            }
    }
    if (violated >= 0) {
        s->lambda[violated] = 1;
        clothi_qp_finish(s, CLOTH_QP_INFEASIBLE, rep);
        return CLOTH_OK;
    }
    clothi_qp_drop_copies(s);
    clothi_qp_order(s);
    for (i = 0; i < s->m; i++) s->w[i] = -s->b[i];
    for (i = 0; i < s->m; i++)
        s->act[i] = s->keep[i] && (o->guess ? o->guess[i] > 0
                                            : s->b[i] > 0 && !clothi_qp_shadowed(s, i, s->w));
    status = clothi_qp_pivot(s, &done);
    if (done) clothi_qp_finish(s, CLOTH_QP_SOLVED, rep);
    if (status == CLOTH_OK && !(done && rep->residual <= o->tolerance)) {
        cloth_qp_outcome outcome;
        rep->precise = 1;
        status = clothi_qp_active_set(s, &outcome, rep);
        if (status == CLOTH_OK) clothi_qp_finish(s, outcome, rep);
        if (rep->outcome == CLOTH_QP_SOLVED && !(rep->residual <= o->tolerance))
            rep->outcome = CLOTH_QP_MAX_ITERATIONS;
        if (status == CLOTH_OK && rep->outcome == CLOTH_QP_MAX_ITERATIONS)
            clothi_qp_diverged(s, rep);
    }
    if (status == CLOTH_ERR_MEMORY)
        return clothi_fail(s->hooks, status, "no memory for qp.m = %i", s->m);
    if (status) return clothi_fail(s->hooks, status, "the cancel hook stopped the QP");
    return CLOTH_OK;
}

/* One row of distinct columns: lambda = max(0, (g.x0 - h) / sum minv g^2). 0: not for here. */
static int clothi_qp_one_row(const cloth_qp *q, double *x, double *lambda, cloth_qp_report *rep) {
    double a = 0, b = -q->h[0], l, slack = q->h[0], size = fabs(slack) + CLOTHI_QP_TINY;
    int    p, i;
    if (q->row[1] > 64) return 0;
    for (p = 0; p < q->row[1]; p++) {
        const double g = q->val[p];
        a += g * g * q->minv[q->col[p]];
        b += g * q->x0[q->col[p]];
        for (i = 0; i < p; i++)
            if (q->col[i] == q->col[p]) return 0;
    }
    l = b > 0 ? b / a : 0;
    if (!(a > 1e-100 && a < 1e100) || !(l < 1e100)) return 0;
    if (x) memcpy(x, q->x0, (size_t)q->n * sizeof *x);
    for (p = 0; p < q->row[1]; p++) {
        const int    c = q->col[p];
        const double to = q->x0[c] - q->minv[c] * (l * q->val[p]), d = to - q->x0[c];
        slack -= q->val[p] * to;
        size += fabs(q->val[p]) * clothi_max(fabs(to), fabs(q->x0[c]));
        if (x) x[c] = to;
        if (q->minv[c] > 0) rep->objective += 0.5 * d * d / q->minv[c];
    }
    if (lambda) lambda[0] = l;
    rep->outcome = CLOTH_QP_SOLVED;
    rep->iterations = 1;
    rep->active = l > 0;
    rep->primal = clothi_max(0, -slack / size);
    if (l > 0) rep->complementarity = fabs(slack) / size;
    rep->residual = clothi_max(rep->primal, rep->complementarity);
    return 1;
}

static cloth_status clothi_qp_check_options(const cloth_hooks *hooks, const cloth_qp *q,
                                            const cloth_qp_options *o) {
    if (!(o->tolerance > 0) || !clothi_finite(o->tolerance))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.tolerance = %g: it is above 0",
                           o->tolerance);
    if (o->max_iterations < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.max_iterations = %i: 0 or more",
                           o->max_iterations);
    if (o->guess) {
        const ptrdiff_t i = clothi_find_nonfinite(o->guess, (size_t)q->m);
        if (i >= 0)
            return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "options.guess[%i] = %g", (int)i,
                               o->guess[i]);
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_qp_solve(const cloth_qp *qp, const cloth_qp_options *opt, double *x,
                                      double *lambda, cloth_qp_report *rep) {
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  report;
    cloth_qp_work    own;
    clothi_qp        s;
    cloth_status     status;
    memset(&report, 0, sizeof report);
    if (rep) *rep = report;
    if (opt && opt->cookie != CLOTHI_QP_COOKIE)
        return CLOTH_ERR_UNINIT;
    if (opt) o = *opt;
    status = clothi_qp_check(&o.hooks, qp);
    if (!status) status = clothi_qp_check_options(&o.hooks, qp, &o);
    if (status) return status;
    if (qp->m == 0) {
        if (x) memcpy(x, qp->x0, (size_t)qp->n * sizeof *x);
        report.outcome = CLOTH_QP_SOLVED;
    } else if (qp->m > 1 || !clothi_qp_one_row(qp, x, lambda, &report)) {
        memset(&own, 0, sizeof own);
        own.hooks = o.hooks;
        memset(&s, 0, sizeof s);
        s.q = qp;
        s.hooks = &o.hooks;
        s.work = o.work ? o.work : &own;
        s.m = qp->m, s.n = qp->n;
        s.most = o.max_iterations ? o.max_iterations : 100 + 10 * qp->m;
        status = clothi_qp_run(&s, &o, &report);
        report.iterations = s.iterations;
        report.factorizations = s.factorizations;
        report.refactorizations = s.refactorizations;
        report.dropped = s.dropped;
        if (!status) {
            const ptrdiff_t i = clothi_find_nonfinite(s.x, (size_t)s.n);
            const ptrdiff_t j = clothi_find_nonfinite(s.lambda, (size_t)s.m);
            if (i >= 0 || j >= 0)
                status = clothi_fail(&o.hooks, CLOTH_ERR_NONFINITE, "qp: %s[%i] would be %g: the "
                                     "numbers are out of range", i >= 0 ? "x" : "lambda",
                                     (int)(i >= 0 ? i : j), i >= 0 ? s.x[i] : s.lambda[j]);
        }
        if (status) memset(&report, 0, sizeof report);
        if (!status && x) memcpy(x, s.x, (size_t)s.n * sizeof *x);
        if (!status && lambda) memcpy(lambda, s.lambda, (size_t)s.m * sizeof *lambda);
        clothi_qp_work_clear(&own);
    }
    if (rep) *rep = report;
    return status;
}

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
    if (!grid || !x || !grid->phi || !(grid->cell > 0)) return CLOTH_ERR_ARGUMENT;
    for (a = 0; a < 3; a++) {
        if (grid->n[a] < 2) return CLOTH_ERR_ARGUMENT;
        if (!clothi_finite(x[a])) return CLOTH_ERR_NONFINITE;
    }
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
 *   or the winding number just outside of it is 1 or more [7.1];
 *   or another face looks at it from nearer than `room`, in which no cloth fits: where a hand comes
 *   to the hip both let go before they meet, or they would pinch what hangs between them.
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
 * Which faces. The rule says of each face alone what it is in a pose, so that it need not be asked
 * of those that no cloth can touch: asked are the faces that meet the cloth's box, grown by 5 % of
 * its largest extent, on the step's way, and those that share a vertex with them; a cloth that
 * turns out to leave that box has it grown, and the rest asked, before detection looks. Contact is
 * the same as if all were asked; exempt_faces counts those asked for. A skirt on a body of 27 000
 * faces asks a fraction, at a third of the cost. A wider list is kept while it holds what is
 * asked, so that a step has one pose to do and not two.
 *
 * Who holds, with desc.push_out > 0. Two parts that both let go leave cloth between them without a
 * hold: it sinks into either, and is inside when they part. So of two faces that meet only one is
 * exempt: that of the component with fewer vertices; in one component the one that is farther, by
 * edges, from the component's middle (half way between two ends), so that hands yield to hips; two
 * that are about as far (an eighth of the way from end to end) by their way from one end, as the
 * left thigh to the right. A face inside is compared with those through which a ray from it comes
 * out. What multipliers name in a zone without a solution yields in the same sense.
 * A limb, that is, a face that yielded as farther out or as the smaller component, and that cloth
 * crosses at the step's end stays exempt in the next step (state: couples of kind CLOTHI_LET_IN),
 * with the faces around it and the limb beyond, outwards along edges as far as an eighth of the way
 * from end to end: it goes out the way it came. Fingers that went on to hold what the palm had gone
 * through dragged a skirt along by 0.3 m; now nothing of it crosses 0.15 s after a pinch.
 * All other cloth inside is led out: each of its vertices, found from crossing faces along edges
 * by the winding number, feels stiffness (g' - g) towards the nearest point of the surface, g' by
 * push_out h above where it is, t/2 outside at most, and pairs of it with that obstacle are
 * exempt; so do vertices outside of which a face still crosses, or the cloth would fall back in.
 * It leaves at the speed push_out. Not for leapfrog.
 *
 * Out, not in. Before a step is accepted faces with a vertex inside that cross the obstacle anew,
 * not beside a pair that is exempt, are looked at: the line in which they cross has to be of cloth
 * that was on the inner side of that face at the step's start (winding number of the same point of
 * the cloth). Where it is not, the vertices of the cloth's face pass only what they meet from the
 * inner side and where the cloth was inside, the second time nothing, and detection looks again.
 * Care from the start held what was half way out, 84 pairs between pinches became 120.
 *
 * Closed components (faces joined along edges, at each of which as many run one way as the other)
 * have an inside; faces of open ones have none, but may cut or lie in a closed one. A component
 * turned inside out is a room: it winds -1, nothing is inside.
 *
 * checked: tests/test_inside.c, tests/test_untangle.c (dives), tests/stability/garments.c */

#define CLOTHI_INSIDE_GRAIN 2048            /* faces or pairs a range                          */
#define CLOTHI_INSIDE_HITS  256             /* boxes on one ray; more: all faces are asked     */

#define CLOTHI_INSIDE_RAYS    16            /* of a region, at least: all when it has fewer    */
#define CLOTHI_INSIDE_NEAR    0.05          /* of the cloth's extent: motion in one step       */
#define CLOTHI_INSIDE_FAR     0.1           /* beyond that: motion in several                  */
#define CLOTHI_INSIDE_OFF     1e-12         /* of the largest coordinate                       */
#define CLOTHI_INSIDE_UNKNOWN (-CLOTH_MAX_COUNT)
#define CLOTHI_INSIDE_MIXED   CLOTH_MAX_COUNT

enum { CLOTHI_INSIDE_CUT = 1, CLOTHI_INSIDE_COVERED = 2, CLOTHI_INSIDE_TOUCHED = 4,
       CLOTHI_INSIDE_NARROW = 8, CLOTHI_INSIDE_HOLDS = 16, CLOTHI_INSIDE_STAYS = 32 };

enum { CLOTHI_OFF = 1, CLOTHI_OFF_STAYS = 2 };  /* of c->off: lets go; until cloth is out again */

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
    unsigned char *need;                    /* [nf] 1: what cloth can reach; all at first      */
    unsigned char *want;                    /* [nf] faces that flags are for, need included    */
    unsigned char *hit;                     /* [hits] how this pair of faces meets             */
    size_t         hits;
    double         reach;                   /* m, largest coordinate                           */
    double         room;                    /* m that cloth needs between two faces; 0: none   */
    int            known;                   /* flags are those of x                            */
    int            rays, regions;           /* of the last pose                                */
    int            some;                    /* want is less than all                           */
    int           *rank;                    /* [nf x 3] NULL: both; sums over the corners of   */
                                            /* edges to the middle and to an end of the        */
                                            /* component, whose number                         */
    int           *size_of, *slack;         /* by component: vertices; ranks that are as one   */
    int           *mid, *part_of;           /* [nv] of vertices: edges to the middle, component */
    int           *start, *around;          /* with rank: the faces around each vertex         */
    double        *want_box;                /* [nf x 6] as box, empty for what is not wanted   */
    clothi_bvh     tree, part;              /* of all; the same with want_box                  */
    clothi_pairs   pairs;
} clothi_inside;

CLOTHI_UNUSED static void clothi_inside_free(clothi_inside *work) {
    cloth_hooks hooks;
    if (!work) return;
    hooks = work->hooks;
    clothi_bvh_free(&hooks, &work->tree);
    clothi_bvh_free(&hooks, &work->part);
    clothi_free(&hooks, work->want_box);
    clothi_pairs_free(&hooks, &work->pairs);
    clothi_free(&hooks, work->faces);
    clothi_free(&hooks, work->x);
    clothi_free(&hooks, work->closed);
    clothi_free(&hooks, work->rank);
    clothi_free(&hooks, work->start);
    clothi_free(&hooks, work->hit);
    clothi_free(&hooks, work);
}

CLOTHI_UNUSED static size_t clothi_inside_bytes(const clothi_inside *work) {
    if (!work) return 0;
    return clothi_block_size(work) + clothi_block_size(work->tree.node) +
           clothi_block_size(work->part.node) + clothi_block_size(work->want_box) +
           clothi_block_size(work->pairs.pair) + clothi_block_size(work->pairs.start) +
           clothi_block_size(work->faces) + clothi_block_size(work->x) +
           clothi_block_size(work->closed) + clothi_block_size(work->rank) +
           clothi_block_size(work->start) + clothi_block_size(work->hit);
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
    k->closed = (unsigned char *)clothi_alloc(hooks, n, 5);
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
    k->need = k->before + n;
    k->want = k->need + n;
    memset(k->need, 1, 2 * n);
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

/* --- who yields --- */

typedef struct clothi_ways {                /* over the vertices of a mesh                     */
    int *start, *around;                    /* faces around each                               */
    int *mid, *end, *part, *queue;          /* [nv]                                            */
} clothi_ways;

/* way [nv] = edges from vertex v to all of its component, where it was < 0; returns how many they
 * are, in queue, the farthest last. */
static int clothi_inside_way(const clothi_inside *k, clothi_ways *w, int v, int *way) {
    int i, j, head = 0, n = 1;
    w->queue[0] = v;
    way[v] = 0;
    while (head < n) {
        const int p = w->queue[head++];
        for (i = w->start[p]; i < w->start[p + 1]; i++)
            for (j = 0; j < 3; j++) {
                const int q = k->faces[3 * w->around[i] + j];
                if (way[q] >= 0) continue;
                way[q] = way[p] + 1;
                w->queue[n++] = q;
            }
    }
    return n;
}

/* The component of vertex v, its `number`: the middle is half way between two ends. */
static void clothi_inside_middle(clothi_inside *k, clothi_ways *w, int v, int number) {
    int i, j, half, m, n = clothi_inside_way(k, w, v, w->mid);
    (void)clothi_inside_way(k, w, w->queue[n - 1], w->end);
    m = w->queue[n - 1];
    k->size_of[number] = n;
    k->slack[number] = 3 * w->end[m] / 8;
    for (half = w->end[m] / 2; w->end[m] > half;) {
        const int at = m;
        for (i = w->start[at]; i < w->start[at + 1]; i++)
            for (j = 0; j < 3; j++) {
                const int q = k->faces[3 * w->around[i] + j];
                if (w->end[q] < w->end[m]) m = q;
            }
    }
    for (i = 0; i < n; i++) w->mid[w->queue[i]] = -1, w->part[w->queue[i]] = number;
    (void)clothi_inside_way(k, w, m, w->mid);
}

/* Ranks of all faces: of two that meet one yields, the other holds. */
static cloth_status clothi_inside_ranks(clothi_inside *k) {
    const size_t n = (size_t)k->nf, m = (size_t)k->nv;
    clothi_ways  w;
    int          f, i, v, parts = 0;
    k->rank = (int *)clothi_alloc(&k->hooks, 3 * n + 4 * m, sizeof(int));
    w.start = (int *)clothi_alloc(&k->hooks, 3 * n + 3 * m + 2, sizeof(int));
    if (!k->rank || !w.start) {
        clothi_free(&k->hooks, w.start);
        return CLOTH_ERR_MEMORY;
    }
    k->size_of = k->rank + 3 * n, k->slack = k->size_of + m;
    w.around = w.start + m + 2;
    w.mid = k->mid = k->slack + m, w.part = k->part_of = k->mid + m;
    w.end = w.around + 3 * n, w.queue = w.end + m;
    for (i = 0; i < 3 * k->nf; i++) w.start[k->faces[i] + 2]++;
    for (v = 0; v < k->nv; v++) {
        w.start[v + 2] += w.start[v + 1];
        w.mid[v] = w.end[v] = -1;
    }
    for (i = 0; i < 3 * k->nf; i++) w.around[w.start[k->faces[i] + 1]++] = i / 3;
    for (v = 0; v < k->nv; v++)
        if (w.mid[v] < 0 && w.start[v + 1] > w.start[v]) clothi_inside_middle(k, &w, v, parts++);
    for (f = 0; f < k->nf; f++) {
        int *r = k->rank + 3 * f;
        for (i = 0; i < 3; i++) {
            v = k->faces[3 * f + i];
            r[0] += w.mid[v], r[1] += w.end[v], r[2] = w.part[v];
        }
    }
    k->start = w.start, k->around = w.around;
    return CLOTH_OK;
}

/* 0 when face g lets go where it meets f; else f does: 2 when f is farther out, as a hand is from
 * a hip, 1 when they are two of a kind, as thighs. */
static int clothi_inside_yields(const clothi_inside *k, int f, int g) {
    const int *p = k->rank + 3 * f, *q = k->rank + 3 * g;
    if (p[2] != q[2]) {
        const int a = k->size_of[p[2]], b = k->size_of[q[2]];
        return (a != b ? a < b : p[2] > q[2]) ? 2 : 0;
    }
    if (abs(p[0] - q[0]) > k->slack[p[2]]) return p[0] > q[0] ? 2 : 0;
    return p[1] != q[1] ? p[1] > q[1] : f > g;
}

/* The one of two faces that meet which lets go; *by, of clothi_inside_yields, says how. */
static int clothi_inside_yielder(const clothi_inside *k, int f, int g, int *by) {
    *by = clothi_inside_yields(k, f, g);
    if (*by) return f;
    *by = clothi_inside_yields(k, g, f);
    return g;
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
            k->box[6 * f + a] = (r[a] < lo ? r[a] : lo) - 0.5 * k->room;
            k->box[6 * f + 3 + a] = (r[a] > hi ? r[a] : hi) + 0.5 * k->room;
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
    for (i = begin; i < end; i++) {
        const int     f = k->pairs.pair[2 * i], g = k->pairs.pair[2 * i + 1];
        const double *p = k->box + 6 * f, *q = k->box + 6 * g;
        int           a, apart = 0;         /* without the room around them */
        for (a = 0; k->room > 0 && a < 3; a++)
            apart |= p[a] + k->room > q[3 + a] + 4e-15 * k->reach ||
                     q[a] + k->room > p[3 + a] + 4e-15 * k->reach;
        k->hit[i] = (unsigned char)(apart ? 0 : clothi_inside_meet(k, f, g));
    }
}

/* The second tree: items and levels of the first, whose boxes are wanted or empty. */
static cloth_status clothi_inside_part(clothi_inside *k) {
    const size_t n = (size_t)k->nf;
    cloth_status status;
    if (k->part.n) return CLOTH_OK;
    if (!k->want_box)
        k->want_box = (double *)clothi_alloc(&k->hooks, 6 * n, sizeof(double));
    if (!k->want_box)
        return clothi_fail(&k->hooks, CLOTH_ERR_MEMORY, "no memory for %i boxes", k->nf);
    status = clothi_bvh_alloc(&k->hooks, k->nf, &k->part);
    if (status == CLOTH_OK) memcpy(k->part.item, k->tree.item, n * sizeof(int));
    else memset(&k->part, 0, sizeof k->part);
    return status;
}

/* Pairs of faces of which one is wanted, each once. */
static cloth_status clothi_inside_wanted(clothi_inside *k) {
    cloth_status status = clothi_inside_part(k);
    int          i, a, n = 0;
    if (status != CLOTH_OK) return status;
    for (i = 0; i < k->nf; i++)
        for (a = 0; a < 6; a++)
            k->want_box[6 * i + a] = k->want[i] ? k->box[6 * i + a]
                                                : (a < 3 ? CLOTHI_HUGE : -CLOTHI_HUGE);
    clothi_bvh_refit(&k->hooks, &k->part, k->want_box);
    status = clothi_bvh_cross_pairs(&k->hooks, &k->part, &k->tree, &k->pairs);
    for (i = 0; i < k->pairs.count; i++) {
        const int f = k->pairs.pair[2 * i], g = k->pairs.pair[2 * i + 1];
        if (f == g || (k->want[g] && g < f)) continue;
        k->pairs.pair[2 * n] = f;
        k->pairs.pair[2 * n++ + 1] = g;
    }
    k->pairs.count = n;
    return status;
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
    if (status == CLOTH_OK)
        status = k->some ? clothi_inside_wanted(k)
                         : clothi_bvh_self_pairs(&k->hooks, &k->tree, &k->pairs);
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

/* The ray from just outside the centroid p [3] of face f, along axis *w; returns how many faces
 * are in hit [CLOTHI_INSIDE_HITS], or would be; -1 for a face without area. */
static int clothi_inside_ray(const clothi_inside *k, int f, double *p, int *axis, int *hit) {
    const double *n = k->normal + 3 * f;
    double        ray[6];
    int           w, a, forward;
    w = fabs(n[0]) >= fabs(n[1]) ? 0 : 1;
    w = fabs(n[2]) > fabs(n[w]) ? 2 : w;
    *axis = w;
    if (!(fabs(n[w]) > 0)) return -1;
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
    return clothi_bvh_box_query(&k->tree, ray, CLOTHI_INSIDE_HITS, hit);
}

/* The winding number just outside the centroid of face f; _UNKNOWN for a face without area. */
static int clothi_inside_outer(clothi_inside *k, int f) {
    double    p[3];
    int       hit[CLOTHI_INSIDE_HITS], w, i, sum = 0;
    const int count = clothi_inside_ray(k, f, p, &w, hit), forward = k->normal[3 * f + w] > 0;
    if (count < 0) return CLOTHI_INSIDE_UNKNOWN;
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
            if (k->flags[b] || !k->want[b]) continue;
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
        if (!k->want[f]) k->flags[f] = CLOTHI_INSIDE_CUT;   /* not asked */
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

/* 0 when face f, which lies inside, holds: it does not yield to a face through which the ray from
 * it comes out, as far as where the ray is outside of all; else as clothi_inside_yields. */
static int clothi_inside_gives(const clothi_inside *k, int f) {
    double    p[3], depth[CLOTHI_INSIDE_HITS], d;
    int       hit[CLOTHI_INSIDE_HITS], turn[CLOTHI_INSIDE_HITS], w, i, j, n = 0, sum = 0;
    int       most = 0;
    const int count = clothi_inside_ray(k, f, p, &w, hit), forward = k->normal[3 * f + w] > 0;
    if (count < 0 || count > CLOTHI_INSIDE_HITS) return 1;
    for (i = 0; i < count; i++) {
        const int *at = k->faces + 3 * hit[i], g = hit[i];
        int        t;
        if (g == f || !k->closed[g]) continue;
        t = clothi_line_cross(k->x + 3 * at[0], k->x + 3 * at[1], k->x + 3 * at[2], w,
                              p[w == 2 ? 0 : w + 1], p[w == 0 ? 2 : w - 1], &d);
        d = forward ? d - p[w] : p[w] - d;
        if (t == 0 || !(d > 0)) continue;
        t = forward ? t : -t;
        sum += t;
        for (j = n++; j > 0 && depth[j - 1] > d; j--)
            depth[j] = depth[j - 1], turn[j] = turn[j - 1], hit[j] = hit[j - 1];
        depth[j] = d, turn[j] = t, hit[j] = g;
    }
    for (i = 0; i < n && sum > 0; i++) {
        const int y = turn[i] > 0 ? clothi_inside_yields(k, f, hit[i]) : 0;
        if (y > most) most = y;
        sum -= turn[i];
    }
    return most;
}

static void clothi_inside_hold(int begin, int end, int worker, void *ctx) {
    clothi_inside *k = (clothi_inside *)ctx;
    int            f;
    (void)worker;
    for (f = begin; f < end; f++) {
        int gives;
        if (!k->want[f] || !k->flags[f]) continue;
        gives = k->flags[f] == CLOTHI_INSIDE_CUT ? k->asked[f] : clothi_inside_gives(k, f);
        k->flags[f] |= gives == 0 ? CLOTHI_INSIDE_HOLDS : gives == 2 ? CLOTHI_INSIDE_STAYS : 0;
    }
}

/* Marks what does not yield to what it meets. */
static void clothi_inside_holders(clothi_inside *k) {
    int i;
    memset(k->asked, 0, (size_t)k->nf * sizeof(int));
    for (i = 0; i < k->pairs.count; i++)
        if (k->hit[i] & CLOTHI_INSIDE_CUT) {
            int       by;
            const int y = clothi_inside_yielder(k, k->pairs.pair[2 * i], k->pairs.pair[2 * i + 1],
                                                &by);
            if (k->asked[y] < by) k->asked[y] = by;
        }
    clothi_for(&k->hooks, k->nf, CLOTHI_INSIDE_GRAIN, clothi_inside_hold, k);
}

/* Whether flags say that a face is no obstacle. */
static int clothi_inside_lets(int flags) {
    return !flags || flags & CLOTHI_INSIDE_HOLDS ? 0
           : flags & CLOTHI_INSIDE_STAYS         ? CLOTHI_OFF | CLOTHI_OFF_STAYS : CLOTHI_OFF;
}

/* --- a pose --- */

/* 1 when two faces are nearer to each other than `room`. */
static int clothi_inside_close(const clothi_inside *k, int f, int g) {
    const int *v[2];
    double     x[12], w[4];
    int        i, j, side;
    v[0] = k->faces + 3 * f, v[1] = k->faces + 3 * g;
    for (side = 0; side < 2; side++)
        for (i = 0; i < 3; i++) {
            memcpy(x, k->x + 3 * v[side][i], 3 * sizeof(double));
            for (j = 0; j < 3; j++)
                memcpy(x + 3 + 3 * j, k->x + 3 * v[1 - side][j], 3 * sizeof(double));
            if (clothi_point_triangle(x, w) < k->room) return 1;
        }
    for (i = 0; i < 9; i++) {
        for (side = 0; side < 2; side++)
            for (j = 0; j < 2; j++)
                memcpy(x + 6 * side + 3 * j,
                       k->x + 3 * v[side][((side ? i / 3 : i % 3) + j) % 3], 3 * sizeof(double));
        if (clothi_edge_edge(x, w) < k->room) return 1;
    }
    return 0;
}

/* Two faces that look at each other with less room between them than cloth needs. */
static int clothi_inside_facing(const clothi_inside *k, int f, int g) {
    const int    *v = k->faces + 3 * f, *u = k->faces + 3 * g;
    const double *n = k->normal + 3 * f, *m = k->normal + 3 * g;
    const double  turn = clothi_dot3(n, m);
    double        d[3] = {0, 0, 0};
    int           i, j;
    if (!(turn < 0) || turn * turn < 0.04 * clothi_dot3(n, n) * clothi_dot3(m, m)) return 0;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            if (v[i] == u[j]) return 0;
            d[j] += k->x[3 * u[i] + j] - k->x[3 * v[i] + j];
        }
    return clothi_dot3(d, n) > 0 && clothi_dot3(d, m) < 0 &&
           clothi_inside_close(k, f, g);
}

static void clothi_inside_narrow(clothi_inside *k) {
    int i;
    for (i = 0; k->room > 0 && i < k->pairs.count; i++) {
        const int f = k->pairs.pair[2 * i], g = k->pairs.pair[2 * i + 1];
        if (k->rank) {
            int       by;
            const int y = clothi_inside_yielder(k, f, g, &by);
            if (clothi_inside_lets(k->flags[y]) || !clothi_inside_facing(k, f, g)) continue;
            k->flags[y] = (unsigned char)((k->flags[y] & ~CLOTHI_INSIDE_HOLDS) |
                                          CLOTHI_INSIDE_NARROW |
                                          (by == 2 ? CLOTHI_INSIDE_STAYS : 0));
            continue;
        }
        if ((k->flags[f] && k->flags[g]) || !clothi_inside_facing(k, f, g)) continue;
        k->flags[f] |= CLOTHI_INSIDE_NARROW;
        k->flags[g] |= CLOTHI_INSIDE_NARROW;
    }
}

/* k->flags of pose x [nv x 3] for the wanted faces, those of others mean nothing; nothing is done
 * again for the pose of the last call. */
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
    if (k->rank) clothi_inside_holders(k);
    clothi_inside_narrow(k);
    k->known = 1;
    return CLOTH_OK;
}

/* Which faces are asked for: those that meet `box` [6] on the way from xa to xb, and those that
 * share a vertex with them. More are looked at, out to `far` around, so that a mesh that moves
 * with the cloth keeps its list, and with it the flags of the pose that it came from. The caller
 * gives spread [nv], scratch. */
CLOTHI_UNUSED static void clothi_inside_near(clothi_inside *k, const double *xa, const double *xb,
                                             const double *box, double far,
                                             unsigned char *spread) {
    int f, a, pass, all = 1, known = 1;
    for (pass = 0; pass < 2; pass++) {      /* what is needed; what is wanted, if that grows */
        const double   more = pass ? far : 0;
        unsigned char *out = pass ? k->want : k->need;
        memset(spread, 0, (size_t)k->nv);
        for (f = 0; f < k->nf; f++) {
            const int *v = k->faces + 3 * f;
            int        apart = 0;
            for (a = 0; a < 3; a++) {
                const double *p = xa + a, *q = xb + a;
                const double  lo = clothi_min(clothi_min(p[3 * v[0]], q[3 * v[0]]),
                                              clothi_min(clothi_min(p[3 * v[1]], q[3 * v[1]]),
                                                         clothi_min(p[3 * v[2]], q[3 * v[2]])));
                const double  hi = clothi_max(clothi_max(p[3 * v[0]], q[3 * v[0]]),
                                              clothi_max(clothi_max(p[3 * v[1]], q[3 * v[1]]),
                                                         clothi_max(p[3 * v[2]], q[3 * v[2]])));
                apart |= lo > box[3 + a] + more || hi < box[a] - more;
            }
            if (!apart) spread[v[0]] = spread[v[1]] = spread[v[2]] = 1;
        }
        for (f = 0; f < k->nf; f++) {
            const int *v = k->faces + 3 * f;
            out[f] = spread[v[0]] || spread[v[1]] || spread[v[2]];
            known &= pass || !out[f] || k->want[f];
        }
        if (pass == 0 && known && k->known) return;
    }
    for (f = 0; f < k->nf; f++) all &= k->want[f];
    k->some = !all;
    k->known = 0;
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
        exempt[f] = (unsigned char)(k->need[f] ? clothi_inside_lets(k->flags[f]) : 0);
        n += exempt[f] != 0;
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
        exempt[f] = (unsigned char)(k->need[f] ? clothi_inside_lets(k->flags[f]) |
                                                 clothi_inside_lets(k->before[f]) : 0);
        n += exempt[f] != 0;
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

/* ===== [8.1] SCENE ===========================================================================
 *
 *   world = cloth, then every obstacle in the order of its slot:
 *
 *     vertices  0 .. nv-1 cloth | nv .. nw-1 obstacles          edges, faces likewise
 *
 *   sphere   a vertex with a radius          capsule   an edge with a radius and its two ends
 *   plane    a vertex and a normal           box       its 8 corners and 12 triangles
 *   grid     a vertex: where its space's origin is
 *
 * so that a sphere, a capsule and a mesh go through one and the same detection: the radius is
 * added to every distance that is asked for. A sphere meets cloth as a point near faces, a capsule
 * as a segment near edges and its ends as points near faces. A plane needs vertices only: a
 * triangle is on its side when its corners are. A grid has vertices in the potential [8.2] and is
 * nothing to detection, zones, crossings and untangling.
 *
 * Two poses: `pose`, of the last accepted state, and `target`, where the next step ends. Both are
 * state; a substep goes from alpha0 to alpha1 of the way between them.
 * checked: tests/test_obstacles.c
 */

enum { CLOTHI_VF = 0, CLOTHI_EE = 1, CLOTHI_VP = 2 };   /* vertex-face, edge-edge; vertex with a
                                                           plane or a grid                     */
enum { CLOTHI_FF = -1, CLOTHI_LET_IN = -2 };    /* faces; faces of which the obstacle's let go  */

/* Who touches: pairs with one key share one anchor of friction: a feature of the cloth with one
 * obstacle (b its slot), or with one side of one part of cloth (b = 2 part + side).
 *   feature 0 vertex, 1 edge, 2 face                                                           */
typedef struct clothi_key {
    int feature, cloth, a, b;               /* cloth 1: b is a part and its side               */
} clothi_key;

/* What a contact remembers from step to step: state. */
typedef struct clothi_anchor {
    clothi_key key;
    int        sliding;
    double     force;                       /* N, normal                                       */
    double     slip[3];                     /* m, elastic part of the tangential motion        */
} clothi_anchor;

typedef struct clothi_touch {               /* an active pair of the proximity potential       */
    clothi_key key;
    int        kind, a, b;
    int        n, v[4];                     /* world vertices                                  */
    double     w[4], normal[3];             /* sum w = 0; towards w > 0                        */
    double     gap;                         /* m at x^n, radius taken off                      */
    double     range;                       /* m                                               */
    double     stiffness;                   /* N/m: k area                                     */
    double     rest;                        /* m, gap at which the force vanishes              */
    double     drift[3];                    /* m, sum of w dx over the obstacle's vertices     */
    double     friction, limit;             /* mu; N, mu times last normal force; 0: none      */
    double     slip[3];
    double     size, trend;                 /* m, |u| of the last iterate and its last change  */
    double     ease;                        /* of the majorizer's excess along u, 0 to 1       */
    int        leader;                      /* carries the anchor of its key                   */
    int        out;                         /* a way out: stiffness (rest - g), no damping     */
    int        soft;                        /* with a grid: gap may be below 0 and over range  */
    double     force;                       /* N at the end of the substep                     */
    double     pull[3];                     /* N, dE/d(sum w x) at the minimiser               */
} clothi_touch;

typedef struct clothi_row {                 /* n . sum w x >= bound over the cloth's vertices  */
    clothi_key key;
    int        kind, a, b;
    int        n, v[4];                     /* world vertices                                  */
    double     w[4], normal[3];
    double     gap;                         /* m at x^n, radius taken off                      */
    double     bound, multiplier;
    double     slack;                       /* m, of bound over what detection asks for        */
    double     speed;                       /* m/s, -n . sum w v of the obstacle's vertices    */
    int        zone;
    int        gone;                        /* its obstacle has let go                         */
} clothi_row;

typedef struct clothi_obstacle {
    int                 used;
    uint32_t            generation;
    cloth_obstacle_kind kind;
    int                 nv, nf;
    int                 v0, f0, e0;         /* first vertex, face and edge in the world        */
    double             *x;                  /* [3 x nv x 3] pose, target, start                */
    int                *faces;              /* own numbering                                   */
    double              radius, friction, normal[3];
    uint32_t            category, mask;
    clothi_inside      *inside;             /* self_penetrating, else NULL              [7.2] */
    const cloth_grid   *grid;               /* borrowed; NULL but for a GRID                   */
} clothi_obstacle;

typedef struct clothi_couple {              /* kind as CLOTHI_VF ...; of two faces also < 0    */
    int kind, a, b;
} clothi_couple;

typedef struct clothi_untangle clothi_untangle;

struct cloth_collide {
    cloth_sim         *sim;
    const cloth_hooks *hooks;
    cloth_collide_desc desc;
    cloth_collide_part *part;               /* [nparts]                                        */
    int                self;                /* CLOTH_CONTACT_SELF                              */
    double             stiffness;           /* Pa/m                                            */

    /* world */
    clothi_obstacle *obstacle;
    int     nobstacle, obstacle_cap;
    int     nv, nf;                         /* cloth's                                         */
    int     nw, mf, me;                     /* world's; edges of capsules come last            */
    int    *faces, *edges;                  /* [mf x 3], [me x 2]                              */
    int    *in, nin, nout;                  /* [nv] obstacle that it was inside of, < 0; how   */
                                            /* many of queue are in, are led out           */
    int    *queue;                          /* [nv] scratch                                    */
    int    *slot;                           /* [nw] obstacle of a vertex, -1: cloth            */
    int    *vertex_part;                    /* [nv]                                            */
    double *area;                           /* [nw] m^2, a third of the faces around           */
    double *xa, *xb;                        /* [nw x 3] start and end of the substep           */
    double *x_ie;                           /* [nv x 3] the candidate                          */
    unsigned char *moved, *frozen;          /* [nv]; frozen 1: rigid, 2: where it was          */
    double         reach[6];                /* m, where exempt faces are looked for            */
    double         ask;                     /* m, range of a query, else 0                     */
    unsigned char *gone;                    /* [mf] scratch                                    */
    unsigned char *off;                     /* [mf] faces exempt in this step                  */
    unsigned char *off_v, *off_e;           /* [nw], [me] all faces around are                 */
    clothi_features features;
    clothi_bvh      tree, solid;            /* of cloth's and of obstacles' faces              */
    double         *box_v, *box_f;          /* [nw x 6], [mf x 6]                              */
    clothi_pairs    meet, vf, ee;
    int            *near_f;                 /* [nf] scratch of box queries                     */
    int             solid_known;            /* the obstacles' boxes are those of this substep  */

    /* the substep */
    clothi_touch *touch;
    int           ntouch, touch_cap;
    clothi_row   *row;
    int           nrow, row_cap;
    clothi_couple  *pair;                     /* candidates                                      */
    int           npair, pair_cap;
    unsigned char *struck;                  /* [struck_cap] CLOTHI_STRUCK_ bits of the pairs   */
    int           struck_cap;
    double        h;
    const double *v_n;                      /* [nv x 3] m/s at its start, the core's           */
    int           begun;                    /* a step is under way                             */
    cloth_ledger  books;                    /* of the substep, for the core's  [8.4]           */
    /* zones */
    int    *zone_of, *zone_number;          /* [nv]                                            */
    int    *local, *member;                 /* [nv] number in a zone, -1; its vertices         */
    int    *zone_start, *zone_cursor, *zone_order;      /* [zone_cap + 1]                      */
    int     zone_cap;
    int    *qp_row, *qp_col;
    double *qp_val, *qp_h, *qp_lambda, *qp_guess, *qp_norm;
    double *qp_minv, *qp_x0, *qp_x;         /* [3 nv]                                          */
    double  mean_mass;                      /* kg, unit of the multipliers of the last QP      */
    int     calms, calm_pass;               /* of the substep: how many, the last one's pass   */
    double  opens;                          /* m, by which rows open a gap; 0 but for leapfrog */
    int     lets_go;                        /* an obstacle penetrates itself                   */
    cloth_qp_options qp_options;

    /* state */
    clothi_anchor *anchor, *next;           /* accepted; of the step under way                 */
    int            nanchor, nnext, anchor_cap, next_cap;
    clothi_couple   *exempt, *now;            /* sorted; accepted, of the step under way         */
    int            nexempt, nnow, exempt_cap, now_cap;
    uint64_t       seen;                    /* hash of the accepted x                          */

    cloth_collide_pair *failed;
    int                 nfailed, failed_cap;
    cloth_collide_report report;
    const clothi_untangle *untangle;        /* under way: what may pass; else NULL      [8.6] */
};

/* Room for one more of what *array holds `size` bytes each; doubles. */
static cloth_status clothi_grow(const cloth_hooks *hooks, void **array, int count, int *cap,
                                size_t size) {
    void *bigger;
    int   want = *cap < 64 ? 64 : *cap > 0x3fffffff ? 0x7fffffff : 2 * *cap;
    if (count < *cap) return CLOTH_OK;
    bigger = clothi_alloc(hooks, (size_t)want, size);
    if (!bigger) return CLOTH_ERR_MEMORY;
    if (*array) memcpy(bigger, *array, (size_t)*cap * size);
    clothi_free(hooks, *array);
    *array = bigger;
    *cap = want;
    return CLOTH_OK;
}

static int clothi_key_compare(const clothi_key *p, const clothi_key *q) {
    if (p->feature != q->feature) return p->feature < q->feature ? -1 : 1;
    if (p->cloth != q->cloth) return p->cloth < q->cloth ? -1 : 1;
    if (p->a != q->a) return p->a < q->a ? -1 : 1;
    return p->b != q->b ? (p->b < q->b ? -1 : 1) : 0;
}

/* --- obstacles --- */

#define CLOTHI_MOST_PASSES     1000000
#define CLOTHI_FINEST          1e-12        /* of the largest coordinate: thickness            */
#define CLOTHI_FARTHEST        1e50         /* m, of a coordinate                              */
#define CLOTHI_COLLIDE_COOKIE  0xC0111DEu
#define CLOTHI_OBSTACLE_COOKIE 0x0B57AC1Eu

CLOTH_API cloth_collide_desc cloth_collide_desc_default(void) {
    cloth_collide_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = CLOTHI_COLLIDE_COOKIE;
    d.thickness = 2e-3;
    d.relaxation = 0.02;
    d.friction = 0.3;
    d.slip = 2e-5;
    d.max_push = 0.1;
    d.max_passes = 40;
    d.push_out = 0.2;
    d.initial = CLOTH_INITIAL_REFUSE;
    return d;
}

CLOTH_API cloth_obstacle_desc cloth_obstacle_desc_default(void) {
    cloth_obstacle_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = CLOTHI_OBSTACLE_COOKIE;
    d.kind = CLOTH_OBSTACLE_MESH;
    d.friction = 0.3;
    d.category = 1;
    d.mask = 0xffffffffu;
    d.normal[1] = 1;
    return d;
}

/* Corner c has bit 0, 1, 2 for the upper side of x, y, z. */
CLOTH_API void cloth_obstacle_box(const double center[3], const double half[3], const double *R,
                                  double *x) {
    int c, i, j;
    for (c = 0; c < 8; c++)
        for (i = 0; i < 3; i++) {
            double *out = x + 3 * c + i;
            *out = center[i];
            for (j = 0; j < 3; j++) {
                double side = (c >> j & 1) ? half[j] : -half[j];
                *out += R ? R[3 * i + j] * side : i == j ? side : 0;
            }
        }
}

static const int clothi_box_faces[36] = {0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5, 0, 1, 5, 0, 5, 4,
                                         2, 6, 7, 2, 7, 3, 0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6};

static int clothi_is_mesh(const clothi_obstacle *o) {
    return o->kind == CLOTH_OBSTACLE_MESH || o->kind == CLOTH_OBSTACLE_BOX;
}

/* Vertices of the cloth are all that meets it. */
static int clothi_is_wall(const clothi_obstacle *o) {
    return o->kind == CLOTH_OBSTACLE_PLANE || o->kind == CLOTH_OBSTACLE_GRID;
}

static void clothi_obstacle_free(const cloth_hooks *hooks, clothi_obstacle *o) {
    const uint32_t generation = o->generation;
    clothi_inside_free(o->inside);
    clothi_free(hooks, o->faces);
    clothi_free(hooks, o->x);
    memset(o, 0, sizeof *o);
    o->generation = generation;
}

/* 0: pose of the last accepted state, 1: target, 2: where it was added */
static double *clothi_pose(const clothi_obstacle *o, int which) {
    return o->x + 3 * (size_t)o->nv * (size_t)which;
}

static clothi_obstacle *clothi_obstacle_of(const cloth_collide *c, cloth_obstacle id) {
    const uint32_t slot = id.id & 0xffffu;
    if (!c || slot == 0 || (int)slot > c->nobstacle) return NULL;
    if (!c->obstacle[slot - 1].used || c->obstacle[slot - 1].generation != id.id >> 16)
        return NULL;
    return c->obstacle + slot - 1;
}

static cloth_obstacle clothi_obstacle_id(const cloth_collide *c, int slot) {
    cloth_obstacle id;
    id.id = slot < 0 ? 0 : (c->obstacle[slot].generation << 16 | (uint32_t)(slot + 1));
    return id;
}


/* --- the world's arrays --- */

/* c gets the arrays of another collide; NULL: none. Nothing is freed. */
static void clothi_world_take(cloth_collide *c, const cloth_collide *from) {
    cloth_collide none;
    if (!from) {
        memset(&none, 0, sizeof none);
        from = &none;
    }
    c->features = from->features, c->tree = from->tree, c->solid = from->solid;
    c->faces = from->faces, c->edges = from->edges, c->slot = from->slot;
    c->area = from->area, c->xa = from->xa, c->xb = from->xb;
    c->box_v = from->box_v, c->box_f = from->box_f;
    c->off = from->off, c->off_v = from->off_v, c->off_e = from->off_e;
    c->gone = from->gone;
    c->me = from->me;
    c->solid_known = 0;
}

static void clothi_world_free(cloth_collide *c) {
    const cloth_hooks *k = c->hooks;
    clothi_features_free(k, &c->features);
    clothi_bvh_free(k, &c->tree);
    clothi_bvh_free(k, &c->solid);
    clothi_free(k, c->faces);
    clothi_free(k, c->edges);
    clothi_free(k, c->slot);
    clothi_free(k, c->area);
    clothi_free(k, c->xa);
    clothi_free(k, c->xb);
    clothi_free(k, c->box_v);
    clothi_free(k, c->box_f);
    clothi_free(k, c->off);
    clothi_free(k, c->off_v);
    clothi_free(k, c->off_e);
    clothi_world_take(c, NULL);
}

/* Areas of the template and of obstacles as they were added: not of now, which is no state. */
static void clothi_world_area(cloth_collide *c) {
    double *x = c->xb;                      /* scratch until a pose is asked for */
    int     f, k, o;
    memset(c->area, 0, (size_t)c->nw * sizeof(double));
    memcpy(x, c->sim->model->x_rest, 3 * (size_t)c->nv * sizeof(double));
    for (o = 0; o < c->nobstacle; o++)
        if (c->obstacle[o].used)
            memcpy(x + 3 * c->obstacle[o].v0, clothi_pose(c->obstacle + o, 2),
                   3 * (size_t)c->obstacle[o].nv * sizeof(double));
    for (f = 0; f < c->mf; f++) {
        const int *v = c->faces + 3 * f;
        double     p[3], q[3], n[3];
        clothi_sub3(x + 3 * v[1], x + 3 * v[0], p);
        clothi_sub3(x + 3 * v[2], x + 3 * v[0], q);
        clothi_cross3(p, q, n);
        for (k = 0; k < 3; k++) c->area[v[k]] += sqrt(clothi_dot3(n, n)) / 6;
    }
}

/* Where everything of the obstacles begins; capsules bring an edge that is no triangle's. */
static int clothi_world_count(cloth_collide *c) {
    int o, capsules = 0;
    c->nw = c->nv, c->mf = c->nf;
    for (o = 0; o < c->nobstacle; o++) {
        clothi_obstacle *b = c->obstacle + o;
        if (!b->used) continue;
        b->v0 = c->nw, b->f0 = c->mf;
        c->nw += b->nv, c->mf += b->nf;
        capsules += b->kind == CLOTH_OBSTACLE_CAPSULE;
    }
    return capsules;
}

static cloth_status clothi_world_trees(cloth_collide *c) {
    cloth_status status;
    clothi_swept_boxes(c->nw, c->xa, NULL, 0, c->box_v);
    clothi_face_boxes(c->mf, c->faces, c->box_v, c->box_f);
    status = clothi_bvh_build(c->hooks, c->nf, c->box_f, &c->tree);
    if (!status)
        status = clothi_bvh_build(c->hooks, c->mf - c->nf, c->box_f + 6 * (size_t)c->nf,
                                  &c->solid);
    c->solid.first = c->nf;
    c->solid_known = 0;
    return status;
}

/* Vertices, faces and edges of cloth and obstacles one behind the other. */
static void clothi_world_fill(cloth_collide *c) {
    int o, i, at = c->features.ne, e = 0;
    while (e < at && c->edges[2 * e] < c->nv) e++;
    for (o = 0; o < c->nobstacle; o++) {
        clothi_obstacle *b = c->obstacle + o;
        if (!b->used) continue;
        for (i = 0; i < b->nv; i++) c->slot[b->v0 + i] = o;
        memcpy(c->xa + 3 * b->v0, clothi_pose(b, 0), 3 * (size_t)b->nv * sizeof(double));
        b->e0 = e;
        while (e < c->features.ne && c->edges[2 * e] < b->v0 + b->nv) e++;
        if (b->kind != CLOTH_OBSTACLE_CAPSULE) continue;
        b->e0 = at;
        c->edges[2 * at] = b->v0;
        c->edges[2 * at++ + 1] = b->v0 + 1;
    }
}

/* Into a collide without a world; what a failure leaves is for clothi_world_free. */
static cloth_status clothi_world_build(cloth_collide *c) {
    const cloth_model *m = c->sim->model;
    const int    capsules = clothi_world_count(c);
    cloth_status status = CLOTH_OK;
    int          o, i;
    c->faces = (int *)clothi_alloc(c->hooks, 3 * (size_t)c->mf, sizeof(int));
    c->slot = (int *)clothi_alloc(c->hooks, (size_t)c->nw, sizeof(int));
    c->area = (double *)clothi_alloc(c->hooks, (size_t)c->nw, sizeof(double));
    c->xa = (double *)clothi_alloc(c->hooks, 3 * (size_t)c->nw, sizeof(double));
    c->xb = (double *)clothi_alloc(c->hooks, 3 * (size_t)c->nw, sizeof(double));
    c->box_v = (double *)clothi_alloc(c->hooks, 6 * (size_t)c->nw, sizeof(double));
    c->box_f = (double *)clothi_alloc(c->hooks, 6 * (size_t)c->mf, sizeof(double));
    c->off = (unsigned char *)clothi_alloc(c->hooks, (size_t)c->mf, 2);
    c->off_v = (unsigned char *)clothi_alloc(c->hooks, (size_t)c->nw, 1);
    if (!c->faces || !c->slot || !c->area || !c->xa || !c->xb || !c->box_v || !c->box_f ||
        !c->off || !c->off_v)
        return CLOTH_ERR_MEMORY;
    c->gone = c->off + c->mf;
    memcpy(c->faces, m->faces, 3 * (size_t)c->nf * sizeof(int));
    memcpy(c->xa, c->sim->state.x, 3 * (size_t)c->nv * sizeof(double));
    for (i = 0; i < c->nv; i++) c->slot[i] = -1;
    for (o = 0; o < c->nobstacle; o++)
        for (i = 0; c->obstacle[o].used && i < 3 * c->obstacle[o].nf; i++)
            c->faces[3 * c->obstacle[o].f0 + i] = c->obstacle[o].faces[i] + c->obstacle[o].v0;
    status = clothi_features_build(c->hooks, c->nw, c->mf, c->faces, &c->features);
    if (status) return status;
    c->me = c->features.ne + capsules;
    c->edges = (int *)clothi_alloc(c->hooks, 2 * (size_t)c->me, sizeof(int));
    c->off_e = (unsigned char *)clothi_alloc(c->hooks, (size_t)c->me, 1);
    if (!c->edges || !c->off_e) return CLOTH_ERR_MEMORY;
    memcpy(c->edges, c->features.edges, 2 * (size_t)c->features.ne * sizeof(int));
    clothi_world_fill(c);
    clothi_world_area(c);
    return clothi_world_trees(c);
}

/* World vertices at the poses alpha0 (xa) and alpha1 (xb) of the step; cloth at x in both. */
static void clothi_world_pose(cloth_collide *c, const double *x, double alpha0, double alpha1) {
    int o, i;
    memcpy(c->xa, x, 3 * (size_t)c->nv * sizeof(double));
    memcpy(c->xb, x, 3 * (size_t)c->nv * sizeof(double));
    for (o = 0; o < c->nobstacle; o++) {
        const clothi_obstacle *b = c->obstacle + o;
        const double *p = b->used ? clothi_pose(b, 0) : NULL, *q = b->used ? clothi_pose(b, 1) : p;
        for (i = 0; b->used && i < 3 * b->nv; i++) {
            c->xa[3 * b->v0 + i] = alpha0 > 0 ? p[i] + alpha0 * (q[i] - p[i]) : p[i];
            c->xb[3 * b->v0 + i] = alpha1 < 1 ? p[i] + alpha1 * (q[i] - p[i]) : q[i];
        }
    }
}

/* --- who may touch whom --- */

static uint32_t clothi_category(const cloth_collide *c, int part, int slot, uint32_t *mask) {
    if (slot >= 0) {
        *mask = c->obstacle[slot].mask;
        return c->obstacle[slot].category;
    }
    *mask = c->part ? c->part[part].mask : 0xffffffffu;
    return c->part ? c->part[part].category : 1u;
}

/* Slots -1: cloth, of the parts p and q. */
static int clothi_may_touch(const cloth_collide *c, int slot_p, int p, int slot_q, int q) {
    uint32_t mask_p, mask_q, cat_p, cat_q;
    if (slot_p >= 0 && slot_q >= 0) return 0;
    if (slot_p < 0 && slot_q < 0) {
        if (!c->self) return 0;
        if (c->part && !(c->part[p].self && c->part[q].self)) return 0;
    }
    cat_p = clothi_category(c, p, slot_p, &mask_p);
    cat_q = clothi_category(c, q, slot_q, &mask_q);
    return (cat_p & mask_q) != 0 && (cat_q & mask_p) != 0;
}

static int clothi_part_of(const cloth_collide *c, int v) {
    return v < c->nv ? c->vertex_part[v] : 0;
}

/* World vertices of a pair and how many they are. */
static int clothi_pair_vertices(const cloth_collide *c, int kind, int a, int b, int *v) {
    if (kind == CLOTHI_EE) {
        v[0] = c->edges[2 * a], v[1] = c->edges[2 * a + 1];
        v[2] = c->edges[2 * b], v[3] = c->edges[2 * b + 1];
        return 4;
    }
    v[0] = a;
    if (kind == CLOTHI_VF) {
        v[1] = c->faces[3 * b], v[2] = c->faces[3 * b + 1], v[3] = c->faces[3 * b + 2];
        return 4;
    }
    v[1] = c->obstacle[b].v0;               /* VP: b is the slot */
    return 2;
}

static int clothi_pair_slot(const cloth_collide *c, int kind, int a, int b) {
    if (kind == CLOTHI_VP) return b;
    a = kind == CLOTHI_EE ? c->edges[2 * a] : a;
    b = kind == CLOTHI_EE ? c->edges[2 * b] : c->faces[3 * b];
    return c->slot[a] >= 0 ? c->slot[a] : c->slot[b];
}

/* What is added to every distance of a pair, m. */
static double clothi_pair_radius(const cloth_collide *c, int kind, int a, int b) {
    const int slot = clothi_pair_slot(c, kind, a, b);
    return slot < 0 || clothi_is_mesh(c->obstacle + slot) ? 0 : c->obstacle[slot].radius;
}

static void clothi_gather_points(const double *x, const int *v, int n, double *out) {
    int k;
    for (k = 0; k < n; k++) memcpy(out + 3 * k, x + 3 * v[k], 3 * sizeof(double));
}

/* The contact thickness of a pair: t; for two places of one cloth that are nearer than 2 t in the
 * template, half their distance there: a fine mesh is not in contact with itself at rest. */
static double clothi_pair_thickness(const cloth_collide *c, int kind, const int *v) {
    double x[12], w[4], d;
    int    k;
    for (k = 0; k < 4; k++)
        if (v[k] >= c->nv) return c->desc.thickness;
    if (c->vertex_part[v[0]] != c->vertex_part[v[3]]) return c->desc.thickness;
    clothi_gather_points(c->sim->model->x_rest, v, 4, x);
    d = clothi_pair_distance(kind, x, w);
    return clothi_min(c->desc.thickness, 0.5 * d);
}

/* --- candidates --- */

static cloth_status clothi_pair_add(cloth_collide *c, int kind, int a, int b) {
    const int    p = kind == CLOTHI_EE ? c->edges[2 * a] : a;
    const int    q = kind == CLOTHI_EE ? c->edges[2 * b] : c->faces[3 * b];
    cloth_status status;
    if (!clothi_may_touch(c, c->slot[p], clothi_part_of(c, p), c->slot[q], clothi_part_of(c, q)))
        return CLOTH_OK;
    if (kind == CLOTHI_VF ? c->off[b] || c->off_v[a] : c->off_e[a] || c->off_e[b])
        return CLOTH_OK;
    status = clothi_grow(c->hooks, (void **)&c->pair, c->npair, &c->pair_cap, sizeof *c->pair);
    if (status) return status;
    c->pair[c->npair].kind = kind, c->pair[c->npair].a = a, c->pair[c->npair].b = b;
    c->npair++;
    return CLOTH_OK;
}

/* The features of the faces in c->meet. */
static cloth_status clothi_pairs_collect(cloth_collide *c) {
    cloth_status status;
    int          i;
    if (c->meet.count == 0) return CLOTH_OK;
    status = clothi_pairs_features(c->hooks, &c->features, &c->meet, c->box_v, &c->vf, &c->ee);
    for (i = 0; i < c->vf.count && !status; i++)
        status = clothi_pair_add(c, CLOTHI_VF, c->vf.pair[2 * i], c->vf.pair[2 * i + 1]);
    for (i = 0; i < c->ee.count && !status; i++)
        status = clothi_pair_add(c, CLOTHI_EE, c->ee.pair[2 * i], c->ee.pair[2 * i + 1]);
    return status;
}

/* A sphere's centre, a capsule's ends against faces; its axis against edges. */
static cloth_status clothi_pairs_lone(cloth_collide *c, int slot, int edge) {
    const clothi_obstacle *o = c->obstacle + slot;
    cloth_status status = CLOTH_OK;
    double       box[6];
    int          i, k, n;
    memcpy(box, c->box_v + 6 * o->v0, sizeof box);
    if (o->nv == 2) clothi_box_join(box, c->box_v + 6 * (o->v0 + 1), box);
    for (k = 0; k < 3; k++) box[k] -= o->radius, box[3 + k] += o->radius;
    n = clothi_bvh_box_query(&c->tree, box, c->nf, c->near_f);
    for (i = 0; i < n && !status; i++) {
        const int f = c->near_f[i];
        for (k = 0; k < o->nv && !status; k++) status = clothi_pair_add(c, CLOTHI_VF, o->v0 + k, f);
        for (k = 0; k < 3 && o->nv == 2 && !status; k++)
            if (c->features.owned[f] >> (3 + k) & 1)
                status = clothi_pair_add(c, CLOTHI_EE, c->features.face_edges[3 * f + k], edge);
    }
    return status;
}

/* The boxes of everything and its trees, for pairs within `reach` (m); swept 0: cloth at xa, where
 * obstacles count with their whole way. */
static void clothi_world_boxes(cloth_collide *c, int swept, double reach) {
    const double pad = 0.5 * clothi_max(reach, c->desc.thickness);
    if (!c->solid_known) {
        const size_t skip = (size_t)c->nv;
        clothi_swept_boxes(c->nw - c->nv, c->xa + 3 * skip, c->xb + 3 * skip, pad,
                           c->box_v + 6 * skip);
        clothi_face_boxes(c->mf - c->nf, c->faces + 3 * (size_t)c->nf, c->box_v,
                          c->box_f + 6 * (size_t)c->nf);
        clothi_bvh_refit(c->hooks, &c->solid, c->box_f + 6 * (size_t)c->nf);
        c->solid_known = 1;
    }
    clothi_swept_boxes(c->nv, c->xa, swept ? c->xb : NULL, pad, c->box_v);
    clothi_face_boxes(c->nf, c->faces, c->box_v, c->box_f);
    clothi_bvh_refit(c->hooks, &c->tree, c->box_f);
}

static int clothi_face_moved(const cloth_collide *c, int f) {
    const int *v = c->faces + 3 * (size_t)f;
    return f < c->nf && (c->moved[v[0]] || c->moved[v[1]] || c->moved[v[2]]);
}

/* Later passes look at what moved in the last one: other pairs of faces have no such feature. */
static void clothi_meet_moved(cloth_collide *c) {
    int i, n = 0;
    for (i = 0; i < c->meet.count; i++) {
        const int f = c->meet.pair[2 * i], g = c->meet.pair[2 * i + 1];
        if (!clothi_face_moved(c, f) && !clothi_face_moved(c, g)) continue;
        c->meet.pair[2 * n] = f;
        c->meet.pair[2 * n++ + 1] = g;
    }
    c->meet.count = n;
}

/* Nothing makes pairs: no self-contact, and all obstacles are walls. */
static int clothi_only_walls(const cloth_collide *c) {
    int o, others = c->self;
    for (o = 0; o < c->nobstacle; o++)
        others |= c->obstacle[o].used && !clothi_is_wall(c->obstacle + o);
    return !others;
}

/* Pairs that come within `reach` (m) of each other on the way from xa to xb; swept 0: at xa, where
 * obstacles count with their whole way. */
static cloth_status clothi_candidates(cloth_collide *c, int swept, double reach) {
    const int    later = swept && c->report.passes > 0;
    cloth_status status;
    int          o, edge = c->features.ne;
    c->npair = 0;
    if (clothi_only_walls(c)) return CLOTH_OK;
    clothi_world_boxes(c, swept, reach);
    status = clothi_bvh_cross_pairs(c->hooks, &c->tree, &c->solid, &c->meet);
    if (!status && later) clothi_meet_moved(c);
    if (!status) status = clothi_pairs_collect(c);
    if (!status && c->self) status = clothi_bvh_self_pairs(c->hooks, &c->tree, &c->meet);
    if (!status && c->self && later) clothi_meet_moved(c);
    if (!status && c->self) status = clothi_pairs_collect(c);
    for (o = 0; o < c->nobstacle && !status; o++) {
        if (!c->obstacle[o].used || clothi_is_mesh(c->obstacle + o) ||
            clothi_is_wall(c->obstacle + o))
            continue;
        status = clothi_pairs_lone(c, o, edge);
        edge += c->obstacle[o].kind == CLOTH_OBSTACLE_CAPSULE;
    }
    return status;
}

/* --- what intersects from the start --- */

/* By kind (-1: faces), a, b. */
static int clothi_pair_compare(const clothi_couple *p, const clothi_couple *q) {
    if (p->kind != q->kind) return p->kind < q->kind ? -1 : 1;
    if (p->a != q->a) return p->a < q->a ? -1 : 1;
    return p->b != q->b ? (p->b < q->b ? -1 : 1) : 0;
}

/* Where p is in the sorted list, or belongs; *there: it is. */
static int clothi_exempt_find(const cloth_collide *c, const clothi_couple *p, int *there) {
    int low = 0, high = c->nnow;
    while (low < high) {
        const int mid = low + (high - low) / 2;
        if (clothi_pair_compare(c->now + mid, p) < 0) low = mid + 1;
        else high = mid;
    }
    *there = low < c->nnow && clothi_pair_compare(c->now + low, p) == 0;
    return low;
}

/* Into the sorted list, once: faces that are there as let in stay that. */
static cloth_status clothi_exempt_add(cloth_collide *c, int kind, int a, int b) {
    clothi_couple p;
    cloth_status  status;
    int           low, there = 0;
    p.kind = CLOTHI_LET_IN, p.a = a, p.b = b;
    if (kind == CLOTHI_FF) (void)clothi_exempt_find(c, &p, &there);
    if (there) return CLOTH_OK;
    p.kind = kind;
    low = clothi_exempt_find(c, &p, &there);
    if (there) return CLOTH_OK;
    status = clothi_grow(c->hooks, (void **)&c->now, c->nnow, &c->now_cap, sizeof p);
    if (status) return status;
    memmove(c->now + low + 1, c->now + low, (size_t)(c->nnow - low) * sizeof p);
    c->now[low] = p;
    c->nnow++;
    return CLOTH_OK;
}

static int clothi_faces_cross(const cloth_collide *c, int f, int g) {
    return clothi_faces_intersect(c->xa, c->faces + 3 * f, c->faces + 3 * g);
}

/* Pairs of faces in c->meet that cross at xa. inside: only with obstacles that penetrate
 * themselves. */
static cloth_status clothi_crossings_of(cloth_collide *c, int inside) {
    cloth_status status = CLOTH_OK;
    int          i;
    for (i = 0; i < c->meet.count && !status; i++) {
        const int f = c->meet.pair[2 * i], g = c->meet.pair[2 * i + 1];
        const int p = c->faces[3 * f], q = c->faces[3 * g], slot = c->slot[q];
        if (inside && (slot < 0 || !c->obstacle[slot].inside)) continue;
        if (c->off[f] || c->off[g] || !clothi_may_touch(c, c->slot[p], clothi_part_of(c, p), slot,
                                                        clothi_part_of(c, q)))
            continue;
        if (clothi_faces_cross(c, f, g)) status = clothi_exempt_add(c, -1, f, g);
    }
    return status;
}

/* Distance left between a cloth feature and a sphere, capsule, plane or grid, m; at: world x. */
static double clothi_lone_gap(const cloth_collide *c, const double *at, int kind, int a, int b) {
    double x[12], w[4];
    int    v[4];
    (void)clothi_pair_vertices(c, kind, a, b, v);
    if (kind == CLOTHI_VP) {
        clothi_sub3(at + 3 * v[0], at + 3 * v[1], x);
        if (!c->obstacle[b].grid) return clothi_dot3(x, c->obstacle[b].normal);
        return cloth_grid_sample(c->obstacle[b].grid, x, w, NULL) ? HUGE_VAL
                                                                  : w[0] - c->obstacle[b].radius;
    }
    clothi_gather_points(at, v, 4, x);
    return clothi_pair_distance(kind, x, w) - clothi_pair_radius(c, kind, a, b);
}

/* Everything that intersects at xa into the list of this step; inside as above. */
static cloth_status clothi_crossings(cloth_collide *c, int inside) {
    cloth_status status;
    int          i, o;
    c->solid_known = 0;
    if (inside) {                           /* faces alone */
        clothi_world_boxes(c, 0, 0);
        status = CLOTH_OK;
    } else
        status = clothi_candidates(c, 0, 0);
    if (!status) status = clothi_bvh_cross_pairs(c->hooks, &c->tree, &c->solid, &c->meet);
    if (!status) status = clothi_crossings_of(c, inside);
    if (status || inside) return status;
    for (i = 0; i < c->npair && !status; i++) {
        const clothi_couple p = c->pair[i];
        if (clothi_pair_radius(c, p.kind, p.a, p.b) > 0 &&
            !(clothi_lone_gap(c, c->xa, p.kind, p.a, p.b) > 0))
            status = clothi_exempt_add(c, p.kind, p.a, p.b);
    }
    for (o = 0; o < c->nobstacle && !status; o++)
        for (i = 0; c->obstacle[o].used && c->obstacle[o].kind == CLOTH_OBSTACLE_PLANE &&
                    i < c->nv && !status; i++)
            if (clothi_may_touch(c, -1, c->vertex_part[i], o, 0) &&
                !(clothi_lone_gap(c, c->xa, CLOTHI_VP, i, o) > 0))
                status = clothi_exempt_add(c, CLOTHI_VP, i, o);
    if (!status && c->self) status = clothi_bvh_self_pairs(c->hooks, &c->tree, &c->meet);
    if (!status && c->self) status = clothi_crossings_of(c, 0);
    return status;
}

/* Names of a pair outside: what is of an obstacle counts in its own mesh. */
static cloth_collide_pair clothi_public_pair(const cloth_collide *c, int kind, int a, int b) {
    cloth_collide_pair p;
    const int          slot = clothi_pair_slot(c, kind, a, b);
    memset(&p, 0, sizeof p);
    p.edge_edge = kind == CLOTHI_EE;
    p.a = a, p.b = b;
    p.obstacle = clothi_obstacle_id(c, slot);
    if (slot < 0) return p;
    p.reversed = c->slot[kind == CLOTHI_EE ? c->edges[2 * a] : a] >= 0;
    if (kind == CLOTHI_VP) p.b = 0;
    else if (kind == CLOTHI_EE) *(p.reversed ? &p.a : &p.b) -= c->obstacle[slot].e0;
    else if (p.reversed) p.a -= c->obstacle[slot].v0;
    else p.b -= c->obstacle[slot].f0;
    return p;
}

/* The same of what intersects: faces, or a feature inside a sphere, capsule or plane. */
static cloth_collide_pair clothi_couple_public(const cloth_collide *c, const clothi_couple *q) {
    cloth_collide_pair p;
    int                slot;
    if (q->kind >= 0) return clothi_public_pair(c, q->kind, q->a, q->b);
    memset(&p, 0, sizeof p);
    slot = c->slot[c->faces[3 * q->b]];
    p.faces = 1;
    p.a = q->a;
    p.b = q->b - (slot < 0 ? 0 : c->obstacle[slot].f0);
    p.obstacle = clothi_obstacle_id(c, slot);
    return p;
}

/* Lists c->now as what failed. */
static cloth_status clothi_list_now(cloth_collide *c) {
    int i;
    c->nfailed = 0;
    for (i = 0; i < c->nnow; i++) {
        cloth_status status = clothi_grow(c->hooks, (void **)&c->failed, c->nfailed,
                                          &c->failed_cap, sizeof *c->failed);
        if (status) return status;
        c->failed[c->nfailed++] = clothi_couple_public(c, c->now + i);
    }
    return CLOTH_OK;
}

/* Looks for intersections at xa; refuses or exempts them as the desc says. */
static cloth_status clothi_contact_check(cloth_collide *c) {
    cloth_status status;
    c->nnow = 0;
    status = clothi_crossings(c, 0);
    if (status || c->nnow == 0 || c->desc.initial == CLOTH_INITIAL_EXEMPT) return status;
    status = clothi_list_now(c);
    if (status) return status;
    return clothi_fail(c->hooks, CLOTH_ERR_STEP,
                       "%i pairs intersect before the step; the first: cloth's %s %i and %s %i of "
                       "%s. CLOTH_INITIAL_EXEMPT lets them pass until they part", c->nfailed,
                       c->failed[0].faces ? "face" : "vertex or edge", c->failed[0].a,
                       c->failed[0].faces ? "face" : "face, edge or slot", c->failed[0].b,
                       c->failed[0].obstacle.id ? "an obstacle" : "cloth");
}

static int clothi_face_has(const cloth_collide *c, int f, int v) {
    return c->faces[3 * f] == v || c->faces[3 * f + 1] == v || c->faces[3 * f + 2] == v;
}

static int clothi_faces_share(const cloth_collide *c, int f, int g) {
    const int *v = c->faces + 3 * f;
    return clothi_face_has(c, g, v[0]) || clothi_face_has(c, g, v[1]) ||
           clothi_face_has(c, g, v[2]);
}

/* The kind of the first pair of the list with which faces f and g share a vertex each, or are one
 * of it; 0: none. */
static int clothi_couples_beside(const cloth_collide *c, const clothi_couple *list, int n, int f,
                                 int g) {
    int i;
    for (i = 0; i < n; i++)
        if (list[i].kind < 0 &&
            ((clothi_faces_share(c, f, list[i].a) && clothi_faces_share(c, g, list[i].b)) ||
             (clothi_faces_share(c, f, list[i].b) && clothi_faces_share(c, g, list[i].a))))
            return list[i].kind;
    return 0;
}

/* Pairs in c->meet that cross at xa and are beside what is exempt, until there are no more. */
static cloth_status clothi_exempt_beside(cloth_collide *c) {
    cloth_status status = CLOTH_OK;
    int          i, n;
    do
        for (n = c->nnow, i = 0; i < c->meet.count && !status; i++) {
            const int f = c->meet.pair[2 * i], g = c->meet.pair[2 * i + 1];
            const int p = c->faces[3 * f], q = c->faces[3 * g], lets = c->off[g] & CLOTHI_OFF_STAYS;
            int       kind;
            if ((c->off[g] && !lets) ||
                !clothi_may_touch(c, c->slot[p], clothi_part_of(c, p), c->slot[q],
                                  clothi_part_of(c, q)) ||
                !clothi_faces_cross(c, f, g))
                continue;
            kind = lets ? CLOTHI_LET_IN : clothi_couples_beside(c, c->now, c->nnow, f, g);
            if (kind) status = clothi_exempt_add(c, kind, f, g);
        }
    while (c->nnow > n && !status);
    return status;
}

/* Where a vertex has gone through the face of an exempt pair, its other faces intersect that face
 * now: the line of intersection wanders, and the exemption with it. Unlisted, such a pair would be
 * held where it is, for good. At xb, the end of the substep. */
static cloth_status clothi_exempt_wander(cloth_collide *c) {
    double      *keep = c->xa;
    cloth_status status;
    int          i, any = c->lets_go && c->desc.push_out > 0;
    for (i = 0; i < c->nnow && !any; i++) any = c->now[i].kind < 0;
    if (!any) return CLOTH_OK;
    c->xa = c->xb;
    clothi_swept_boxes(c->nw, c->xa, NULL, 0, c->box_v);
    clothi_face_boxes(c->mf, c->faces, c->box_v, c->box_f);
    clothi_bvh_refit(c->hooks, &c->tree, c->box_f);
    clothi_bvh_refit(c->hooks, &c->solid, c->box_f + 6 * (size_t)c->nf);
    c->solid_known = 0;
    status = clothi_bvh_cross_pairs(c->hooks, &c->tree, &c->solid, &c->meet);
    if (!status) status = clothi_exempt_beside(c);
    if (!status && c->self) status = clothi_bvh_self_pairs(c->hooks, &c->tree, &c->meet);
    if (!status && c->self) status = clothi_exempt_beside(c);
    c->xa = keep;
    return status;
}

/* Drops what has parted, at the end of an accepted step. */
static void clothi_exempt_part(cloth_collide *c) {
    double *keep = c->xa;
    int     i, n = 0;
    c->xa = c->xb;                          /* where everything is now */
    for (i = 0; i < c->nnow; i++) {
        const clothi_couple p = c->now[i];
        const int         still = p.kind < 0 ? clothi_faces_cross(c, p.a, p.b)
                                             : !(clothi_lone_gap(c, c->xa, p.kind, p.a, p.b) > 0);
        if (still) c->now[n++] = p;
    }
    c->nnow = n;
    c->xa = keep;
}

/* --- obstacles that penetrate themselves --- */

/* Edges of which all faces are exempt. */
static void clothi_inside_edges_off(cloth_collide *c) {
    memset(c->off_e, 0, (size_t)c->me);
    clothi_inside_spread(c->mf, c->features.face_edges, c->off, c->features.ne, c->off_e);
}

/* The cloth's box from xa to x (may be xa), and the pads of pairs around it: [6]. */
static void clothi_cloth_box(const cloth_collide *c, const double *x, double *box) {
    const double pad = 1.01 * clothi_max(c->desc.thickness, c->ask);
    int          i, a;
    for (a = 0; a < 3; a++) box[a] = HUGE_VAL, box[3 + a] = -HUGE_VAL;
    for (i = 0; i < c->nv; i++)
        for (a = 0; a < 3; a++) {
            box[a] = clothi_min(box[a], clothi_min(c->xa[3 * i + a], x[3 * i + a]));
            box[3 + a] = clothi_max(box[3 + a], clothi_max(c->xa[3 * i + a], x[3 * i + a]));
        }
    for (a = 0; a < 3; a++) {
        box[a] -= pad;
        box[3 + a] += pad;
    }
}

/* Faces inside their own obstacle at the start or the end of the substep are exempt in it, and the
 * vertices and edges that have no other: among those that the cloth can reach [7.2]. x [nv x 3]:
 * where the cloth may go from xa. What is exempt stays so. */
static cloth_status clothi_inside_reach(cloth_collide *c, const double *x) {
    cloth_status status = CLOTH_OK;
    double       size = 0, box[6];
    int          o, i;
    clothi_cloth_box(c, x, box);
    for (i = 0; i < 3; i++) size = clothi_max(size, box[3 + i] - box[i]);
    for (i = 0; i < 6; i++) c->reach[i] = box[i] + (i < 3 ? -1 : 1) * CLOTHI_INSIDE_NEAR * size;
    for (o = 0; o < c->nobstacle && !status; o++) {
        const clothi_obstacle *b = c->obstacle + o;
        const double *pa = c->xa + 3 * b->v0, *pb = c->xb + 3 * b->v0;
        int           count = 0;
        if (!b->used || !b->inside) continue;
        c->lets_go = 1;
        clothi_inside_near(b->inside, pa, pb, c->reach, CLOTHI_INSIDE_FAR * size,
                           c->off_v + b->v0);
        status = clothi_inside_sweep(b->inside, pa, pb, c->gone + b->f0, &count);
        for (i = b->f0, count = 0; i < b->f0 + b->nf && !status; i++) {
            count += c->gone[i] && !c->off[i];
            c->off[i] |= c->gone[i];
        }
        if (!status)
            clothi_inside_spread(b->nf, b->faces, c->off + b->f0, b->nv, c->off_v + b->v0);
        c->report.exempt_faces += count;
    }
    if (c->lets_go) clothi_inside_edges_off(c);
    else memset(c->off_e, 0, (size_t)c->me);
    return status;
}

static cloth_status clothi_inside_faces(cloth_collide *c) {
    memset(c->off, 0, (size_t)c->mf);
    memset(c->off_v, 0, (size_t)c->nw);
    c->report.exempt_faces = 0;
    c->lets_go = 0;
    return clothi_inside_reach(c, c->xa);
}

/* The limb from vertex v of obstacle b outwards, as far as two faces of it count as equally far
 * out, marked 1 in off_v. */
static void clothi_inside_limb(cloth_collide *c, const clothi_obstacle *b, int v) {
    const clothi_inside *k = b->inside;
    const int            far = k->mid[v] + k->slack[k->part_of[v]] / 3;
    unsigned char       *mark = c->off_v + b->v0;
    int                 *queue = k->up, head = 0, n = 1, i, j;  /* scratch of the flags */
    queue[0] = v;
    mark[v] = 1;
    while (head < n) {
        const int p = queue[head++];
        for (i = k->start[p]; i < k->start[p + 1]; i++)
            for (j = 0; j < 3; j++) {
                const int q = k->faces[3 * k->around[i] + j];
                if (mark[q] || k->mid[q] < k->mid[p] || k->mid[q] > far) continue;
                mark[q] = 1;
                if (n < k->nf) queue[n++] = q;
            }
    }
}

/* Faces that let cloth in let go, with those around them and the limb beyond, which would carry off
 * what it has gone through, until it is out again. */
static void clothi_inside_stays(cloth_collide *c) {
    int o, i, k, any = 0;
    for (o = 0; o < c->nobstacle; o++) {
        const clothi_obstacle *b = c->obstacle + o;
        unsigned char         *near_by = c->gone + b->f0;
        int                    found = 0;
        if (!b->used || !b->inside) continue;
        memset(c->off_v + b->v0, 0, (size_t)b->nv);
        for (i = 0; i < c->nnow; i++)
            if (c->now[i].kind == CLOTHI_LET_IN && c->now[i].b >= b->f0 &&
                c->now[i].b < b->f0 + b->nf)
                for (k = 0, found = 1; k < 3; k++)
                    clothi_inside_limb(c, b, c->faces[3 * c->now[i].b + k] - b->v0);
        for (i = 0; i < b->nf && found; i++) {
            const int *v = c->faces + 3 * (b->f0 + i);
            near_by[i] = c->off_v[v[0]] || c->off_v[v[1]] || c->off_v[v[2]]
                             ? CLOTHI_OFF | CLOTHI_OFF_STAYS : 0;
            c->report.exempt_faces += near_by[i] && !c->off[b->f0 + i];
            c->off[b->f0 + i] |= near_by[i];
        }
        clothi_inside_spread(b->nf, b->faces, c->off + b->f0, b->nv, c->off_v + b->v0);
        any |= found;
    }
    if (any) clothi_inside_edges_off(c);
}

/* Before detection: has cloth left the box that exempt faces were looked for in? */
static cloth_status clothi_inside_again(cloth_collide *c) {
    double box[6];
    int    a, out = 0;
    if (!c->lets_go) return CLOTH_OK;
    clothi_cloth_box(c, c->xb, box);
    for (a = 0; a < 3; a++) out |= !(box[a] >= c->reach[a] && box[3 + a] <= c->reach[3 + a]);
    return out ? clothi_inside_reach(c, c->xb) : CLOTH_OK;
}

/* --- ways out --- */

#define CLOTHI_GAP_OUT  0.5                 /* of t, beyond the surface                        */
#define CLOTHI_BESIDE   (-CLOTH_MAX_COUNT)  /* - slot: outside, a face around it crosses       */
#define CLOTHI_CAREFUL  CLOTH_MAX_COUNT     /* + slot: inside, passes with care                */
#define CLOTHI_OUT_HITS 512                 /* boxes on one ray; more: all faces are asked     */

/* Winding number at p of obstacle `slot` at pose x, xa or xb: what a ray upwards meets of its
 * closed parts, face `but` left out. */
static int clothi_inside_wind(const cloth_collide *c, int slot, const double *x, int but,
                              const double *p) {
    const clothi_obstacle *o = c->obstacle + slot;
    double                 ray[6], depth = 0;
    int                    hit[CLOTHI_OUT_HITS], i, n, wind = 0, all;
    for (i = 0; i < 3; i++) ray[i] = ray[3 + i] = p[i];
    ray[5] = CLOTHI_HUGE;
    n = clothi_bvh_box_query(&c->solid, ray, CLOTHI_OUT_HITS, hit);
    all = n > CLOTHI_OUT_HITS;
    for (i = 0; i < (all ? o->nf : n); i++) {
        const int  f = all ? o->f0 + i : hit[i];
        const int *v = c->faces + 3 * f;
        int        turn;
        if (f < o->f0 || f >= o->f0 + o->nf || f == but || !o->inside->closed[f - o->f0]) continue;
        turn = clothi_line_cross(x + 3 * v[0], x + 3 * v[1], x + 3 * v[2], 2, p[0], p[1], &depth);
        if (turn && depth > p[2]) wind += turn;
    }
    return wind;
}

static int clothi_inside_point(const cloth_collide *c, int slot, const double *p) {
    return clothi_inside_wind(c, slot, c->xa, -1, p) >= 1;
}

/* Asks for the corners of cloth face f, once each; those inside join the queue. */
static void clothi_inside_ask(cloth_collide *c, int f, int slot) {
    int k;
    for (k = 0; k < 3; k++) {
        const int v = c->faces[3 * f + k];
        if (c->in[v] >= 0 || c->in[v] == -2 - slot) continue;
        c->in[v] = -2 - slot;               /* outside of that one */
        if (!clothi_inside_point(c, slot, c->xa + 3 * v)) continue;
        c->in[v] = slot;
        c->queue[c->nin++] = v;
    }
}

/* Cloth vertices inside of obstacles that penetrate themselves: those of faces that cross them, be
 * it where they let go, and on from there along edges. */
static cloth_status clothi_insiders(cloth_collide *c) {
    const cloth_topology *t = c->sim->model->topology;
    cloth_status          status;
    int                   i, j;
    c->nin = 0;
    for (i = 0; i < c->nv; i++) c->in[i] = -1;
    clothi_world_boxes(c, 0, 0);
    status = clothi_bvh_cross_pairs(c->hooks, &c->tree, &c->solid, &c->meet);
    for (i = 0; i < c->meet.count && !status; i++) {
        const int f = c->meet.pair[2 * i], g = c->meet.pair[2 * i + 1];
        const int slot = c->slot[c->faces[3 * g]], *v = c->faces + 3 * f;
        if (!c->obstacle[slot].inside ||
            (c->in[v[0]] != -1 && c->in[v[1]] != -1 && c->in[v[2]] != -1) ||
            !clothi_may_touch(c, -1, clothi_part_of(c, v[0]), slot, 0) ||
            !clothi_faces_cross(c, f, g))
            continue;
        clothi_inside_ask(c, f, slot);
    }
    for (i = 0; i < c->nin && !status; i++) {
        const int v = c->queue[i];
        for (j = t->vf_start[v]; j < t->vf_start[v + 1]; j++)
            clothi_inside_ask(c, t->vf[j], c->in[v]);
    }
    c->nout = c->nin;
    for (i = 0; i < c->nnow && !status; i++) {
        const int slot = c->now[i].kind == CLOTHI_FF ? c->slot[c->faces[3 * c->now[i].b]] : -1;
        for (j = 0; j < 3 && slot >= 0 && c->obstacle[slot].inside; j++) {
            const int v = c->faces[3 * c->now[i].a + j];
            if (c->in[v] >= 0 || c->in[v] <= CLOTHI_BESIDE) continue;
            c->in[v] = CLOTHI_BESIDE - slot;
            c->queue[c->nout++] = v;
        }
    }
    return status;
}

/* Sum of the normals at xa of the faces around the obstacle's feature of a pair. */
static void clothi_leaves_normal(const cloth_collide *c, const clothi_obstacle *o, int kind,
                                 int a, int b, double *n) {
    const clothi_inside *k = o->inside;
    const int           *e = c->edges + 2 * b;
    const int            v = (kind == CLOTHI_EE ? e[0] : a) - o->v0;
    int                  i, j, count = 1, f = b;
    n[0] = n[1] = n[2] = 0;
    if (kind == CLOTHI_EE || a >= c->nv) count = k->start[v + 1] - k->start[v];
    for (i = 0; i < count; i++) {
        double p[3], q[3], m[3];
        const int *at;
        if (kind == CLOTHI_EE || a >= c->nv) f = o->f0 + k->around[k->start[v] + i];
        at = c->faces + 3 * f;
        if (kind == CLOTHI_EE && at[0] != e[1] && at[1] != e[1] && at[2] != e[1]) continue;
        clothi_sub3(c->xa + 3 * at[1], c->xa + 3 * at[0], p);
        clothi_sub3(c->xa + 3 * at[2], c->xa + 3 * at[0], q);
        clothi_cross3(p, q, m);
        for (j = 0; j < 3; j++) n[j] += m[j];
    }
}

/* Whether a pair that meets, weights w and normal n, may pass. A pair of which a cloth vertex is
 * inside may, on its way out; but where that once ended with cloth farther in (clothi_leaves_not)
 * only if it meets on the inner side of the obstacle and where the cloth was inside at xa. */
static int clothi_leaves(const cloth_collide *c, int kind, int a, int b, const double *w,
                         const double *n) {
    const int slot = clothi_pair_slot(c, kind, a, b);
    double    p[3] = {0, 0, 0}, sum = 0, out[3];
    int       v[4], i, k, count, in = 0;
    if (slot < 0) return 0;
    count = clothi_pair_vertices(c, kind, a, b, v);
    for (i = 0; i < count; i++) {
        if (v[i] >= c->nv) continue;
        in |= c->in[v[i]] == slot ? 1 : c->in[v[i]] == CLOTHI_CAREFUL + slot ? 2 : 0;
        sum += w[i];
        for (k = 0; k < 3; k++) p[k] += w[i] * c->xa[3 * v[i] + k];
    }
    if (in < 2) return in;
    if (!(fabs(sum) > 0.5)) return 0;
    for (k = 0; k < 3; k++) p[k] /= sum;
    clothi_leaves_normal(c, c->obstacle + slot, kind, a, b, out);
    return sum * clothi_dot3(n, out) < 0 && clothi_inside_point(c, slot, p);
}

/* Where an edge from p to q meets triangle t [3 x 3], a point; 0: it does not. */
static int clothi_leaves_meet(const double *t, const double *p, const double *q, double *at) {
    double e[3], f[3], n[3], d[3], s, r, lo = 1, hi = -1;
    int    i, k;
    clothi_sub3(t + 3, t, e);
    clothi_sub3(t + 6, t, f);
    clothi_cross3(e, f, n);
    clothi_sub3(p, t, d);
    s = clothi_dot3(n, d);
    clothi_sub3(q, t, d);
    r = clothi_dot3(n, d);
    if ((s < 0) == (r < 0)) return 0;
    for (k = 0; k < 3; k++) at[k] = p[k] + s / (s - r) * (q[k] - p[k]);
    for (i = 0; i < 3; i++) {
        double turn;
        clothi_sub3(t + 3 * (i == 2 ? 0 : i + 1), t + 3 * i, e);
        clothi_sub3(at, t + 3 * i, d);
        clothi_cross3(e, d, f);
        turn = clothi_dot3(f, n);
        lo = clothi_min(lo, turn);
        hi = clothi_max(hi, turn);
    }
    return lo >= 0 || hi <= 0;
}

/* Cloth face f and face g of the obstacle, which cross at xb: the line in which they do is of cloth
 * that was on the inner side of g at xa. Both ends, a tenth in, and the middle are asked. */
static int clothi_leaves_line(const cloth_collide *c, int slot, int f, int g) {
    double t[2][9], old[9], end[2][3], e[3], d[3], n[3], w[4];
    int    i, k, side, up, count = 0;
    clothi_gather_points(c->xb, c->faces + 3 * f, 3, t[0]);
    clothi_gather_points(c->xb, c->faces + 3 * g, 3, t[1]);
    clothi_gather_points(c->xa, c->faces + 3 * f, 3, old);
    for (side = 0; side < 2; side++)
        for (i = 0; i < 3 && count < 2; i++)
            count += clothi_leaves_meet(t[side], t[1 - side] + 3 * i,
                                        t[1 - side] + 3 * (i == 2 ? 0 : i + 1), end[count]);
    if (count < 2) return 0;
    clothi_sub3(t[1] + 3, t[1], e);
    clothi_sub3(t[1] + 6, t[1], d);
    clothi_cross3(e, d, n);
    up = !(n[2] > 0);                       /* the ray begins on the inner side */
    for (i = 0; i < 3; i++) {
        double x[12], p[3] = {0, 0, 0}, now[3];
        for (k = 0; k < 3; k++) now[k] = end[0][k] + (0.1 + 0.4 * i) * (end[1][k] - end[0][k]);
        memcpy(x, now, sizeof now);
        memcpy(x + 3, t[0], sizeof t[0]);
        (void)clothi_point_triangle(x, w);
        for (k = 0; k < 9; k++) p[k % 3] -= w[1 + k / 3] * old[k];
        if (clothi_inside_wind(c, slot, c->xa, -1, p) <=
            clothi_inside_wind(c, slot, c->xb, g, now) - up)
            return 0;
    }
    return 1;
}

typedef struct clothi_exit {
    const cloth_collide *c;
    int                  slot;
} clothi_exit;

static double clothi_exit_face2(int f, const double *p, void *ctx) {
    const cloth_collide   *c = ((const clothi_exit *)ctx)->c;
    const clothi_obstacle *o = c->obstacle + ((const clothi_exit *)ctx)->slot;
    double                 x[12], w[4], d;
    if (f < o->f0 || f >= o->f0 + o->nf || !o->inside->closed[f - o->f0]) return HUGE_VAL;
    memcpy(x, p, 3 * sizeof(double));
    clothi_gather_points(c->xa, c->faces + 3 * f, 3, x + 3);
    d = clothi_pair_distance(CLOTHI_VF, x, w);
    return d * d;
}

/* The touch that leads vertex v out by the nearest point of what holds. */
static cloth_status clothi_way_out(cloth_collide *c, int v) {
    const double t = c->desc.thickness;
    const int    in = c->in[v] >= 0;
    clothi_exit  e;
    clothi_touch q;
    double       x[12], d[3] = {0, 0, 0}, d1[3], d2[3], away = HUGE_VAL, size;
    int          i, k, f;
    cloth_status status;

    e.c = c, e.slot = in ? c->in[v] : CLOTHI_BESIDE - c->in[v];
    f = clothi_bvh_nearest(&c->solid, c->xa + 3 * v, clothi_exit_face2, &e, &away);
    if (f < 0 || !(away < HUGE_VAL) || (c->off[f] & CLOTHI_OFF_STAYS))
        return CLOTH_OK;
    memset(&q, 0, sizeof q);
    q.kind = CLOTHI_VF, q.a = v, q.b = f;
    q.n = clothi_pair_vertices(c, CLOTHI_VF, v, f, q.v);
    clothi_gather_points(c->xa, q.v, 4, x);
    away = clothi_pair_distance(CLOTHI_VF, x, q.w);
    for (i = 0; i < 4; i++)
        for (k = 0; k < 3; k++) d[k] -= (in ? 1 : -1) * q.w[i] * x[3 * i + k];
    if (!in && away > c->sim->edge) return CLOTH_OK;
    if (!(away > 1e-3 * t)) {
        clothi_sub3(x + 6, x + 3, d1);
        clothi_sub3(x + 9, x + 3, d2);
        clothi_cross3(d1, d2, d);
    }
    size = sqrt(clothi_dot3(d, d));
    if (!(size > 0)) return CLOTH_OK;
    for (k = 0; k < 3; k++) q.normal[k] = d[k] / size;
    q.gap = in ? -away : away;
    q.out = 1, q.size = -1, q.ease = 1;
    q.range = t;
    q.rest = q.gap + c->desc.push_out * c->h;
    if (in) q.rest = clothi_min(q.rest, CLOTHI_GAP_OUT * t);
    q.stiffness = c->stiffness * c->area[v];
    q.key.feature = 3, q.key.a = v, q.key.b = e.slot;
    for (i = 1; i < 4; i++)
        for (k = 0; k < 3; k++)
            q.drift[k] += q.w[i] * (c->xb[3 * q.v[i] + k] - c->xa[3 * q.v[i] + k]);
    status = clothi_grow(c->hooks, (void **)&c->touch, c->ntouch, &c->touch_cap, sizeof q);
    if (!status) c->touch[c->ntouch++] = q;
    return status;
}

static cloth_status clothi_ways_out(cloth_collide *c) {
    cloth_status status = CLOTH_OK;
    int          i;
    for (i = 0; i < c->nout && !status; i++) status = clothi_way_out(c, c->queue[i]);
    return status;
}

/* ===== [8.2] PROXIMITY AND FRICTION ==========================================================
 *
 *        g = n . sum w_i x_i - radius          gap, n and w of the closest points at x^n
 *        |
 *    t --+- - - - - - - - - - -  range: from here in the cloth feels the obstacle
 *   t/2 -+- - - - - - - - - - -  gap that the impact zones keep                          [8.3]
 *   t/4 -+- - - - - - - - - - -  separation that detection guards
 *     0 =========================
 *
 * E_col, a sum over the pairs (vertex-face, edge-edge, sphere, ...) that are nearer than t at the
 * start of the substep, with k = stiffness x area:
 *
 *     force(g) = max( 0, k (t - g)^2 / t  -  c (g - g^n) / h ),       c = k tau,   g < t
 *
 * an elastic part and a damping, which together never pull. force falls with g, so E = -integral
 * of force dg is convex; with P(g) = k (t-g)^3/(3t) + c (g-g^n)^2/(2h) and g0 where the force ends,
 * E = P(min(g, g0)); E'' = 2k (t-g)/t + c/h below g0. With n and w of x^n g is linear in x: the
 * Hessian E'' (w n)(w n)' is exact and positive semidefinite. What is dropped: how n and w turn
 * within a substep; detection [8.3] looks at the true motion afterwards. What was not in range at
 * x^n is not felt: an impact is the zones' work, not a spring's, and does not rebound.
 *
 * The damping makes what was pushed in come out at (t/2)^2/(t tau) = t/(4 tau), 25 mm/s by
 * default: 0.03 mm of rebound. A dropped cloth rests where its weight is carried.
 *
 * k follows the load: with the normal force N that an anchor remembers, k >= 4 N/t holds N at t/2;
 * at most 100 times, for N holds the damping too, and that grows with k (a twisted tube ran away to
 * 1e15 N without a bound). What an impact left does not rebound.
 *
 * Friction, with the normal force N of the last accepted substep, u = s + (I - n n') sum w dx the
 * tangential motion since the anchor was set and eps = desc.slip:
 *
 *     E = mu N ( u^2/eps - u^3/(3 eps^2)   |u| <= eps: sticks;      |u| - eps/3   beyond: slides )
 *
 * a potential in x, convex. Its Hessian along u is 0 beyond eps: Newton's step leaps across the
 * kink to the other side, and line searches of 2^-10 passed for convergence. In its place stands
 * mu N (force/|u|) (I - n n'): the gradient stays, E is bounded from above (it is concave in u^2),
 * nothing overshoots, and at u = 0 it is exact; 3667 halvings in 120 steps of cloth pulled through
 * a ring became 42. When the step is accepted s becomes u, cut to length eps: what sticks remembers
 * where and does not creep (the elastic-plastic anchor of Cundall and Strack 1979).
 * N = force(g) at the end + what the zones added, multiplier / h^2: Coulomb's law with N one
 * substep late, right in sum over an impact.
 *
 * Onset of sliding. Alone the majorizer creeps: with a pull F = mu N (1 + d) on a mass m its
 * iterates are u <- u (1 + d)/(1 + u m/(mu N h^2)), a factor of 1 + d each where it begins to
 * slide. A strip around a cylinder (tests/validate/capstan.c, tolerance 1e-7) made 400 updates of
 * 3e-7 m there, each lowering phi by twice what was foretold: phi was straight along u. So the
 * majorizer's excess over the exact curvature along u is multiplied by `ease`: CLOTHI_EASE times
 * less whenever |u| has changed twice in the same sense and by little, 1 again when it turns. phi
 * and its gradient stay, the Hessian remains semidefinite. The strip, 1.05 times the threshold:
 * at most 28 iterations a step, 11 in the mean; and with 1e-6, where updates of 3e-7 m had passed
 * for convergence 1e-4 m before the minimum, 1163 iterations became about 900.
 *
 * One cloth vertex near many faces of one obstacle is one anchor (clothi_key): a fold of the
 * obstacle's mesh under it changes the pair, not the memory.
 * Triangles pressed flat. A triangle shares its vertices with itself, so that no pair keeps a
 * corner off the opposite edge, and StVK gives way below 0.577. On that edge the triangle's normal
 * is none and beyond it the opposite one: the angles of its hinges leap by up to pi, and their
 * energy with them. Where neighbours push a corner to the edge and the leap bars the way, phi has
 * no minimum but ends on a wall: a T-shirt of scanned folds left 2 of 120 steps so (bending leapt
 * by 1e-3 J within 1e-10 m, stretches of 1e-7 to 1e-10; slope and value agreed in every other
 * term), after 400 iterations or fewer, with forces of 0.05 to 0.3 N. So E_col has a term for each
 * triangle below J = CLOTHI_FLAT of its rest area A, with r = (J/CLOTHI_FLAT)^2,
 *
 *     E = K A b(r),   b = -(1 - r)^2 log r,   K = CLOTHI_FLAT_STIFF (mu + lambda),   r < 1
 *
 * twice differentiable at r = 1 [LFS20] and without bound at r = 0. J is convex in each corner and
 * E falls with it, so that the definite model keeps the part of the Hessian along J alone: (b'' +
 * b'/(2 r)) dr dr' >= 0. Had the hinge's energy a factor that falls to 0 with the area instead, the
 * wall would be a well, and such triangles would stay flat. With 0.2 for CLOTHI_FLAT a crumpling
 * sheet took half as many iterations again in the median step, with 0.1 no more than without.
 * [LFS20] Li et al., Incremental Potential Contact, ACM TOG 39 (2020), doi 10.1145/3386569.3392425.
 *
 * Distance grids. No zone stands behind the potential, so that it has to stop what comes, and cloth
 * may be inside:
 *
 *      phi - radius        g = gap + n.(sum w dx),  n = grad phi / |grad phi|
 *     3 t -+-              nearer than this at x^n: gap and n are of there
 *       t -+-              range. From farther away the way h v^n of the vertex, less the
 *       0 =====            grid's, is followed by steps of phi - t, 64 at most; where it comes
 *          |               nearer than 3 t gap and n are taken, and gap reckoned back along n
 *   -band -+-              deeper: phi is flat, no n, nothing is felt
 *
 *     force(g) = max( 0, k min((t - g)^2/t, t)  -  c (g - min(g^n, t))/h ),
 *                                                       c = k max(tau, 20 ms)
 *
 * The damping begins at t, so that an impact at speed w ends m w/c below t, 0.2 mm at 2 m/s by
 * default, in the step in which it arrives. The cap makes what lies deep come out at k t/c =
 * t/max(tau, 20 ms), 0.1 m/s by default, at any depth: by it alone nothing leaves faster (what
 * the cloth adds is the cloth's). E stays convex, E'' = c/h below the cap. Where |grad phi| < 1e-3,
 * in the middle of a limb or beyond the band, there is no way out: such a vertex is led by its
 * neighbours; take a band as deep as cloth may begin. Loads over k t are held by the stiffening
 * above. n jumps between the cells of the grid by some cell/radius of curvature; the height it
 * rests at is off by the interpolant's error, cell^2/(8 radius).
 *
 * checked: tests/test_friction.c (differences), tests/test_contact.c, tests/validate/incline.c,
 *   stopping.c, resting.c, drop.c, capstan.c; tests/test_flat.c; grids: tests/test_grid_contact.c
 */

#define CLOTHI_STIFFER 100                  /* times, under load                               */
#define CLOTHI_EASE    0.25                 /* factor of q->ease, see 'Onset of sliding'       */
#define CLOTHI_EASE_AT 0.1                  /* of |u|: changes below it are slow               */
#define CLOTHI_SOFT_NEAR  3                 /* t, from a grid at x^n: felt from range on       */
#define CLOTHI_SOFT_LOOKS 64                /* samples along the way to a grid, at most        */
#define CLOTHI_SOFT_FLAT  1e-3              /* |grad phi| below which there is no way out      */
#define CLOTHI_SOFT_TIME  0.02              /* s, least relaxation at a grid                   */

/* Whether a vertex comes near a grid on its straight way through the substep; then the frame where
 * it does, the gap reckoned back to x^n. */
static int clothi_touch_soft(const cloth_collide *c, clothi_touch *q) {
    const clothi_obstacle *o = c->obstacle + q->b;
    const double t = c->desc.thickness, *a = c->xa, *b = c->xb;
    const double close = clothi_min(CLOTHI_SOFT_NEAR * t, 0.5 * (t + o->grid->band - o->radius));
    const int    v = 3 * q->v[0], at = 3 * q->v[1];
    double       p[3], way[3], d = 0, s = 0, size, slope;
    int          i, k;
    for (k = 0; k < 3; k++) way[k] = c->h * c->v_n[v + k] - (b[at + k] - a[at + k]);
    size = sqrt(clothi_dot3(way, way));
    for (i = 0; i < CLOTHI_SOFT_LOOKS; i++) {
        for (k = 0; k < 3; k++) p[k] = a[v + k] - a[at + k] + s * way[k];
        if (cloth_grid_sample(o->grid, p, &d, q->normal)) return 0;
        d -= o->radius;
        if (d < close || !(s < 1)) break;
        s = d - t < (1 - s) * size ? s + (d - t) / size : 1;
    }
    slope = sqrt(clothi_dot3(q->normal, q->normal));
    if (!(d < close) || !(slope > CLOTHI_SOFT_FLAT)) return 0;
    for (k = 0; k < 3; k++) q->normal[k] /= slope;
    q->gap = d - s * clothi_dot3(way, q->normal);
    q->w[0] = 1, q->w[1] = -1;
    q->soft = 1;
    return 1;
}

/* gap, normal and weights of a pair at xa; 0: on top of each other. */
static int clothi_touch_frame(const cloth_collide *c, clothi_touch *q) {
    double x[12], r[3] = {0, 0, 0}, d, radius = clothi_pair_radius(c, q->kind, q->a, q->b);
    int    i, k;
    if (q->kind == CLOTHI_VP && c->obstacle[q->b].grid) return clothi_touch_soft(c, q);
    memset(x, 0, sizeof x);
    clothi_gather_points(c->xa, q->v, q->n, x);
    if (q->kind == CLOTHI_VP) {
        memcpy(q->normal, c->obstacle[q->b].normal, sizeof q->normal);
        q->w[0] = 1, q->w[1] = -1;
        for (k = 0; k < 3; k++) r[k] = x[k] - x[3 + k];
        q->gap = clothi_dot3(q->normal, r);
        return q->gap > 0;
    }
    (void)clothi_pair_distance(q->kind, x, q->w);
    for (i = 0; i < q->n; i++)
        for (k = 0; k < 3; k++) r[k] += q->w[i] * x[3 * i + k];
    d = sqrt(clothi_dot3(r, r));
    q->gap = d - radius;
    for (k = 0; k < 3; k++) q->normal[k] = d > 0 ? r[k] / d : 0;
    return q->gap > 0 && d > 0;
}

/* Which side of the cloth around vertex v a normal lies on. */
static int clothi_vertex_side(const cloth_collide *c, int v, const double *normal) {
    const cloth_topology *t = c->sim->model->topology;
    double sum = 0;
    int    i;
    for (i = t->vf_start[v]; i < t->vf_start[v + 1]; i++) {
        const int *f = c->faces + 3 * t->vf[i];
        double     p[3], q[3], n[3];
        clothi_sub3(c->xa + 3 * f[1], c->xa + 3 * f[0], p);
        clothi_sub3(c->xa + 3 * f[2], c->xa + 3 * f[0], q);
        clothi_cross3(p, q, n);
        sum += clothi_dot3(n, normal);
    }
    return sum < 0;
}

static clothi_key clothi_key_of(const cloth_collide *c, int kind, int a, int b,
                                const double *normal) {
    clothi_key key;
    const int  slot = clothi_pair_slot(c, kind, a, b);
    memset(&key, 0, sizeof key);
    key.feature = kind == CLOTHI_EE;
    key.a = a, key.b = slot;
    if (kind == CLOTHI_VF && a >= c->nv)    /* of the obstacle: the cloth has the face */
        key.feature = 2, key.a = b;
    else if (kind == CLOTHI_EE && c->edges[2 * a] >= c->nv)
        key.a = b;
    if (slot >= 0) return key;
    key.cloth = 1;
    a = kind == CLOTHI_EE ? c->edges[2 * a] : a;
    b = kind == CLOTHI_EE ? c->edges[2 * b] : c->faces[3 * b];
    key.b = 2 * clothi_part_of(c, b) + clothi_vertex_side(c, a, normal);
    return key;
}

static double clothi_pair_friction(const cloth_collide *c, int kind, int a, int b) {
    const int slot = clothi_pair_slot(c, kind, a, b);
    return slot < 0 ? c->desc.friction : c->obstacle[slot].friction;
}

/* The area that a pair stands for, m^2: that of its smaller half, vertex, edge or face; spheres and
 * capsules have none. Cloth meets cloth from both sides: half. */
static double clothi_pair_area(const cloth_collide *c, int kind, int a, int b) {
    double p, q, share = clothi_pair_slot(c, kind, a, b) < 0 ? 0.5 : 1;
    if (kind == CLOTHI_VP) return c->area[a];
    if (kind == CLOTHI_VF) {
        const int *f = c->faces + 3 * b;
        p = c->area[a];
        q = (c->area[f[0]] + c->area[f[1]] + c->area[f[2]]) / 6;
    } else {                                /* 3 edges a vertex */
        p = (c->area[c->edges[2 * a]] + c->area[c->edges[2 * a + 1]]) / 6;
        q = (c->area[c->edges[2 * b]] + c->area[c->edges[2 * b + 1]]) / 6;
    }
    return share * (p > 0 && (p < q || !(q > 0)) ? p : q);
}

/* c/h, N/m. */
static double clothi_touch_damping(const cloth_collide *c, const clothi_touch *q) {
    const double tau = c->desc.relaxation;
    return q->stiffness * (q->soft ? clothi_max(tau, CLOTHI_SOFT_TIME) : tau) / c->h;
}

/* force(g) and its slope, N and N/m. */
static double clothi_touch_force(const cloth_collide *c, const clothi_touch *q, double g,
                                 double *slope) {
    const double damp = clothi_touch_damping(c, q), from = clothi_min(q->gap, q->range);
    const double in = g < q->range ? q->range - g : 0;
    if (slope) *slope = 0;
    if (!(g < q->rest)) return 0;
    if (slope && q->out) *slope = q->stiffness;
    if (q->out) return q->stiffness * (q->rest - g);
    if (q->soft && in > q->range) {
        if (slope) *slope = damp;
        return q->stiffness * q->range - damp * (g - from);
    }
    if (slope) *slope = 2 * q->stiffness * in / q->range + damp;
    return q->stiffness * in * in / q->range - damp * (g - from);
}

/* The elastic part of P at g, J; at a grid it grows linearly below 0. */
static double clothi_touch_elastic(const clothi_touch *q, double g) {
    const double in = g < q->range ? q->range - g : 0;
    if (q->soft && in > q->range) return q->stiffness * q->range * (in - 2 * q->range / 3);
    return q->stiffness * in * in * in / (3 * q->range);
}

/* P(min(g, g0)). */
static double clothi_touch_energy(const cloth_collide *c, const clothi_touch *q, double g) {
    const double damp = clothi_touch_damping(c, q);
    double       out;
    g = clothi_min(g, q->rest);
    if (q->out) return 0.5 * q->stiffness * (q->rest - g) * (q->rest - g);
    out = g - clothi_min(q->gap, q->range);
    return clothi_touch_elastic(q, g) + 0.5 * damp * out * out;
}

/* Where the force ends: k u^2/t + c u/h = c (t - g^n)/h, u = t - g0; at a grid's cap k t for the
 * first. */
static double clothi_touch_rest(const cloth_collide *c, const clothi_touch *q) {
    const double damp = clothi_touch_damping(c, q), a = q->stiffness / q->range;
    const double in = q->range - clothi_min(q->gap, q->range);
    double       u;
    if (!(q->stiffness > 0) || !(damp > 0)) return q->range;
    u = 2 * damp * in / (damp + sqrt(damp * damp + 4 * a * damp * in));
    if (q->soft && u > q->range) u = in - q->stiffness * q->range / damp;
    return q->range - u;
}

/* Edges nearest at the end of one: that vertex and the other edge's faces are a pair already. Two
 * vertices on top of each other would bring 64 edge pairs. A capsule has no faces. */
static int clothi_touch_twice(const cloth_collide *c, const clothi_touch *q) {
    int i;
    if (q->kind != CLOTHI_EE || clothi_pair_radius(c, q->kind, q->a, q->b) > 0) return 0;
    for (i = 0; i < 4; i++)
        if (fabs(q->w[i]) < 1e-9) return 1;
    return 0;
}

/* Adds the pair to the list when it is in range. */
static cloth_status clothi_touch_add(cloth_collide *c, int kind, int a, int b) {
    clothi_touch *q;
    int           i, k;
    cloth_status  status = clothi_grow(c->hooks, (void **)&c->touch, c->ntouch, &c->touch_cap,
                                       sizeof *q);
    if (status) return status;
    q = c->touch + c->ntouch;
    memset(q, 0, sizeof *q);
    q->kind = kind, q->a = a, q->b = b;
    q->n = clothi_pair_vertices(c, kind, a, b, q->v);
    if (!clothi_touch_frame(c, q)) return CLOTH_OK;
    if (!q->soft && q->gap >= c->desc.thickness) return CLOTH_OK;
    if (clothi_touch_twice(c, q)) return CLOTH_OK;
    q->range = q->n == 4 ? clothi_pair_thickness(c, kind, q->v) : c->desc.thickness;
    if (!q->soft && q->gap >= q->range) return CLOTH_OK;
    q->stiffness = c->stiffness * clothi_pair_area(c, kind, a, b);
    q->rest = clothi_touch_rest(c, q);
    q->size = -1, q->ease = 1;
    q->friction = clothi_pair_friction(c, kind, a, b);
    q->key = clothi_key_of(c, kind, a, b, q->normal);
    for (i = 0; i < q->n; i++)
        for (k = 0; q->v[i] >= c->nv && k < 3; k++)
            q->drift[k] += q->w[i] * (c->xb[3 * q->v[i] + k] - c->xa[3 * q->v[i] + k]);
    c->ntouch++;
    return CLOTH_OK;
}

static int clothi_touch_before(const clothi_touch *p, const clothi_touch *q) {
    const int order = clothi_key_compare(&p->key, &q->key);
    if (order) return order < 0;
    if (p->gap < q->gap || q->gap < p->gap) return p->gap < q->gap;
    if (p->kind != q->kind) return p->kind < q->kind;
    return p->a != q->a ? p->a < q->a : p->b < q->b;
}

/* Heap sort by key, then gap: the nearest pair of a key leads. */
static void clothi_touch_sort(clothi_touch *t, int n) {
    int start = n / 2, end = n, root, child;
    clothi_touch swap;
    while (end > 1) {
        if (start > 0)
            start--;
        else {
            end--;
            swap = t[0], t[0] = t[end], t[end] = swap;
        }
        for (root = start; (child = 2 * root + 1) < end; root = child) {
            if (child + 1 < end && clothi_touch_before(t + child, t + child + 1)) child++;
            if (!clothi_touch_before(t + root, t + child)) break;
            swap = t[root], t[root] = t[child], t[child] = swap;
        }
    }
}

/* Gives every key's leader what its anchor remembers. Both lists are sorted. */
static void clothi_touch_remember(cloth_collide *c) {
    int i, j = 0, k;
    for (i = 0; i < c->ntouch; i++) {
        clothi_touch *q = c->touch + i;
        double        along;
        q->leader = i == 0 || clothi_key_compare(&q[-1].key, &q->key) != 0;
        if (!q->leader || q->out) continue;
        while (j < c->nnext && clothi_key_compare(&c->next[j].key, &q->key) < 0) j++;
        if (j == c->nnext || clothi_key_compare(&c->next[j].key, &q->key) != 0) continue;
        q->limit = q->friction * c->next[j].force;
        if (q->stiffness < 4 * c->next[j].force / q->range) {
            q->stiffness = clothi_min(4 * c->next[j].force / q->range,
                                      CLOTHI_STIFFER * q->stiffness);
            q->rest = clothi_touch_rest(c, q);
        }
        along = clothi_dot3(c->next[j].slip, q->normal);
        for (k = 0; k < 3; k++) q->slip[k] = c->next[j].slip[k] - along * q->normal[k];
    }
}

/* sum w dx over a touch, m; x [nv x 3]. */
static void clothi_touch_motion(const cloth_collide *c, const clothi_touch *q, const double *x,
                                double *u) {
    int i, k;
    memcpy(u, q->drift, 3 * sizeof(double));
    for (i = 0; i < q->n; i++)
        for (k = 0; q->v[i] < c->nv && k < 3; k++)
            u[k] += q->w[i] * (x[3 * q->v[i] + k] - c->xa[3 * q->v[i] + k]);
}

/* Sets q->ease for the iteration at x: see 'Onset of sliding'. */
static void clothi_touch_ease(const cloth_collide *c, clothi_touch *q, const double *x) {
    double u[3], along, size, change;
    int    k;
    clothi_touch_motion(c, q, x, u);
    along = clothi_dot3(u, q->normal);
    for (k = 0; k < 3; k++) u[k] += q->slip[k] - along * q->normal[k];
    size = sqrt(clothi_dot3(u, u));
    change = q->size < 0 ? 0 : size - q->size;
    if (change * q->trend < 0)
        q->ease = 1;
    else if (change * q->trend > 0 &&
             fabs(change) < CLOTHI_EASE_AT * clothi_max(size, c->desc.slip))
        q->ease *= CLOTHI_EASE;
    q->trend = change;
    q->size = size;
}

/* Energy of a touch with force [3] on sum w x (minus the gradient) and the 3x3 Hessian K. */
static double clothi_touch_eval(const cloth_collide *c, const clothi_touch *q, const double *x,
                                double *pull, double *K) {
    const double eps = c->desc.slip;
    double       u[3], g, slope, force, energy, size, along, bend, less;
    int          i, j;
    clothi_touch_motion(c, q, x, u);
    along = clothi_dot3(u, q->normal);
    g = q->gap + along;
    force = clothi_touch_force(c, q, g, &slope);
    energy = clothi_touch_energy(c, q, g);
    for (i = 0; i < 3; i++) {
        pull[i] = -force * q->normal[i];
        for (j = 0; j < 3; j++) K[3 * i + j] = slope * q->normal[i] * q->normal[j];
        u[i] += q->slip[i] - along * q->normal[i];
    }
    if (!(q->limit > 0)) return energy;
    size = sqrt(clothi_dot3(u, u));
    bend = size < eps ? 2 / eps - size / (eps * eps) : 1 / size;        /* force / (limit size) */
    energy += q->limit * (size < eps ? size * size * (1 / eps - size / (3 * eps * eps))
                                     : size - eps / 3);
    less = size > 0 ? (1 - q->ease) / (size * pow(clothi_max(size, eps), 2)) : 0;
    for (i = 0; i < 3; i++) {
        pull[i] += q->limit * bend * u[i];
        for (j = 0; j < 3; j++)
            K[3 * i + j] += q->limit * (bend * ((i == j) - q->normal[i] * q->normal[j]) -
                                        less * u[i] * u[j]);
    }
    return energy;
}

static cloth_status clothi_touch_hessian(const cloth_collide *c, const clothi_touch *q,
                                         const double *K, cloth_matrix *A) {
    double H[144], w[4];
    int    v[4], n = 0, i, j, k;
    for (i = 0; i < q->n; i++)
        if (q->v[i] < c->nv) {
            v[n] = q->v[i];
            w[n++] = q->w[i];
        }
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++)
            for (j = 0; j <= i; j++) {      /* what the matrix reads                           */
                double *h = H + (3 * i + k) * 3 * n + 3 * j;
                h[0] = w[i] * w[j] * K[3 * k];
                h[1] = w[i] * w[j] * K[3 * k + 1];
                h[2] = w[i] * w[j] * K[3 * k + 2];
            }
    return cloth_matrix_add_element(A, n, v, H);
}

/* --- triangles pressed flat, see the section's head --- */

#define CLOTHI_FLAT       0.1               /* of the rest area: below it a triangle resists   */
#define CLOTHI_FLAT_STIFF 0.02              /* K of mu + lambda                                */
#define CLOTHI_FLAT_LEAST 1e-12             /* r below which b goes on as a straight line      */

/* b(r), its slope and its curvature, r < 1. */
static double clothi_flat_barrier(double r, double *slope, double *curve) {
    const double s = clothi_max(r, CLOTHI_FLAT_LEAST), u = 1 - s, l = log(s);
    *slope = 2 * u * l - u * u / s;
    *curve = r < s ? 0 : -2 * l + 4 * u / s + u * u / (s * s);
    return *slope * (r - s) - u * u * l;
}

/* d2|a x b|^2/d(a, b)2 [6x6] times t, added to D. */
static void clothi_flat_curve(const double *a, const double *b, double t, double *D) {
    const double aa = clothi_dot3(a, a), bb = clothi_dot3(b, b), ab = clothi_dot3(a, b);
    int          i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            const double m = 2 * t * (2 * a[i] * b[j] - b[i] * a[j] - (i == j ? ab : 0));
            D[6 * i + j] += 2 * t * ((i == j ? bb : 0) - b[i] * b[j]);
            D[6 * (3 + i) + 3 + j] += 2 * t * ((i == j ? aa : 0) - a[i] * a[j]);
            D[6 * i + 3 + j] += m;
            D[6 * (3 + j) + i] += m;
        }
}

/* H [9x9] of the corners from D [6x6] of a = x1 - x0 and b = x2 - x0. */
static void clothi_flat_corners(const double *D, double *H) {
    static const double part[2][3] = {{-1, 1, 0}, {-1, 0, 1}};
    int                 i, j, p, q;
    for (i = 0; i < 9; i++)
        for (j = 0; j < 9; j++) {
            double sum = 0;
            for (p = 0; p < 2; p++)
                for (q = 0; q < 2; q++)
                    sum += part[p][i / 3] * part[q][j / 3] *
                           D[6 * (3 * p + i % 3) + 3 * q + j % 3];
            H[9 * i + j] = sum;
        }
}

/* r of corners p, q, o whose triangle has twice / 2 of area at rest. */
static double clothi_flat_ratio(const double *p, const double *q, const double *o, double twice) {
    double a[3], b[3], n[3];
    clothi_sub3(q, p, a);
    clothi_sub3(o, p, b);
    clothi_cross3(a, b, n);
    return clothi_dot3(n, n) / (CLOTHI_FLAT * CLOTHI_FLAT * twice * twice);
}

/* E of one triangle: x [3x3], twice its rest area, k = K (J). grad [9] N; hess [9x9] N/m or NULL,
 * with psd the part along r. 0 and nothing written when the triangle is not flat. */
static double clothi_flat_energy(const double *x, double twice, double k, double *grad,
                                 double *hess, int psd) {
    const double rest = CLOTHI_FLAT * CLOTHI_FLAT * twice * twice;
    const double r = clothi_flat_ratio(x, x + 3, x + 6, twice);
    double       a[3], b[3], n[3], g[6], D[36], slope, curve, energy;
    int          i, j;
    if (!(r < 1)) return 0;
    clothi_sub3(x + 3, x, a);
    clothi_sub3(x + 6, x, b);
    clothi_cross3(a, b, n);
    energy = k * clothi_flat_barrier(r, &slope, &curve);
    clothi_cross3(b, n, g);
    clothi_cross3(n, a, g + 3);
    for (i = 0; i < 6; i++) g[i] *= 2 / rest;
    for (i = 0; grad && i < 3; i++) {
        grad[3 + i] = k * slope * g[i];
        grad[6 + i] = k * slope * g[3 + i];
        grad[i] = -grad[3 + i] - grad[6 + i];
    }
    if (!hess) return energy;
    if (psd) curve = clothi_max(curve + 0.5 * slope / clothi_max(r, CLOTHI_FLAT_LEAST), 0);
    for (i = 0; i < 6; i++)
        for (j = 0; j < 6; j++) D[6 * i + j] = k * curve * g[i] * g[j];
    if (!psd) clothi_flat_curve(a, b, k * slope / rest, D);
    clothi_flat_corners(D, hess);
    return energy;
}

/* Adds the flat ones' energy at e->x, their shares of e->grad and e->hess, and to *work (NULL: not
 * wanted) gradient times motion since x^n. Leapfrog has no E_col. */
static cloth_status clothi_flat_eval(const cloth_collide *c, const cloth_eval *e, double *energy,
                                     double *work) {
    const cloth_model  *m = c->sim->model;
    const cloth_params *p = &c->sim->params;
    const double       *x = e->x;
    cloth_status        status = CLOTH_OK;
    int                 f, i;
    if (m->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG) return CLOTH_OK;
    for (f = 0; f < m->nf && !status; f++) {
        const int    *v = m->faces + 3 * (size_t)f;
        const double *X = p->X + 6 * (size_t)f;
        const double  twice = (X[2] - X[0]) * (X[5] - X[1]) - (X[4] - X[0]) * (X[3] - X[1]);
        double        y[9], g[9], H[81], mu, lambda;
        if (!(clothi_flat_ratio(x + 3 * v[0], x + 3 * v[1], x + 3 * v[2], twice) < 1)) continue;
        for (i = 0; i < 9; i++) y[i] = x[3 * v[i / 3] + i % 3];
        cloth_material_lame(p->material + m->region[f], &mu, &lambda);
        *energy += clothi_flat_energy(y, twice, 0.5 * CLOTHI_FLAT_STIFF * (mu + lambda) *
                                      fabs(twice), g, e->hess ? H : NULL, e->psd);
        for (i = 0; e->grad && i < 9; i++) e->grad[3 * v[i / 3] + i % 3] += g[i];
        for (i = 0; work && i < 9; i++) *work += g[i] * (y[i] - c->xa[3 * v[i / 3] + i % 3]);
        if (e->hess) status = cloth_matrix_add_element(e->hess, 3, v, H);
    }
    return status;
}

/* cloth_contact.eval: outside a step there is nothing, E_col belongs to the motion from x^n. */
static cloth_status clothi_contact_eval(void *user, const cloth_eval *e, double *energy) {
    cloth_collide *c = (cloth_collide *)user;
    cloth_status   status = CLOTH_OK;
    int            i, j, k;
    *energy = 0;
    if (!c->begun || !(e->h > 0)) return CLOTH_OK;
    for (i = 0; i < c->ntouch && !status; i++) {
        const clothi_touch *q = c->touch + i;
        double              pull[3], K[9];
        *energy += clothi_touch_eval(c, q, e->x, pull, K);
        for (j = 0; e->grad && j < q->n; j++)
            for (k = 0; q->v[j] < c->nv && k < 3; k++)
                e->grad[3 * q->v[j] + k] += q->w[j] * pull[k];
        if (e->hess) status = clothi_touch_hessian(c, q, K, e->hess);
    }
    if (!status) status = clothi_flat_eval(c, e, energy, NULL);
    return status;
}

/* ===== [8.3] IMPACT ZONES ====================================================================
 *
 *   candidate x_IE of the Newton solve
 *     -> detection over x^n -> x: every pair that comes nearer than its separation is an impact
 *     -> a row each, from the frame (w, n) at the time of impact, n on the side held at x^n:
 *              n . sum w_i x_i >= bound                 obstacles and pins are in the bound
 *     -> rows that share a movable vertex are one zone; in each zone
 *              min sum m_i |x_i - x_IE,i|^2 / 2     s.t. all its rows so far              [6.1]
 *     -> detection again, for pairs of what moved; until there is no impact
 *
 * The objective is always measured from x_IE: rows accumulate, motions do not. Rows push along n
 * with w that sum to 0, so free cloth keeps its linear momentum to rounding; its angular momentum
 * as far as sum w_i x_i is along n when the row is made (two sheets that meet: 1e-14 and 1e-3 of
 * the sums of the sizes).
 *
 * Bound: t/2, but no more than the pair had at x^n: contact stops, it does not throw. Separation:
 * t/4, but no more than 0.8 of the distance at x^n: what began too near may not come nearer.
 *
 * Up to 200 rows the QP is exact. Larger zones are swept: row after row gets the multiplier that
 * makes it hold (coordinate ascent in the dual, Hildreth 1957), there and back, until none moves by
 * a tenth of its slack, what its bound asks for over what detection guards. Three of four sweeps
 * take only the rows that push: 24000 rows take 0.03 s a pass. Over-relaxation took more passes.
 * Momentum is kept to rounding, like the rows; where sweeps do not end in time the next pass goes
 * on from their multipliers, and after some passes the exact QP decides, up to 1000 rows.
 *
 * A zone whose rows contradict each other, or push by more than max_push, first lets go of what its
 * multipliers name of an obstacle that penetrates itself (an arm that pinches a sleeve): those
 * faces are exempt for the rest of the step and counted in exempt_faces.
 * A zone whose QP is still infeasible, or that does not end, has rows about ways too far: its
 * candidate is calmed, that is, cut to a quarter of what it differs by from a rigid motion, its
 * rows are forgotten, and detection begins again. After two such cuts it becomes rigid: free of
 * obstacles it moves as one body with its momentum, else with its obstacle, or not at all. (A tube
 * twisted by 3 turns was rigid in 282 of 480 steps, its ends turning alone; calmed it never is.)
 * What still collides fails the step with the pairs listed.
 *
 * Leapfrog gives v* with the candidate. A vertex of an active row gets the mean velocity of the
 * step instead, (x - x^n)/h, in a free zone plus what restores the momentum of v*; then v solves
 * min |v - v*|^2_M / 2 with no approach on the active rows. With v* alone the swings of the
 * substeps stay: a drape at 240 Hz took 78 J out of a fall of 0.4 J. It still gains energy where
 * many substeps lie in one step, for a push strains what the substeps had relaxed: 3 J at 18
 * substeps, none at 4. There being no E_col, rows open what is nearer than t/4 by up to
 * h t/(4 relaxation), and approach ends at 0.95 of the distance: at 0.8 gaps fell to 0.01 t.
 */

#define CLOTHI_SEPARATION 0.25              /* of t                                            */
#define CLOTHI_GAP        0.5
#define CLOTHI_APPROACH   0.8               /* of the distance at x^n                          */
#define CLOTHI_NEARER     0.95              /* the same for leapfrog                           */
#define CLOTHI_ROOM       1.5               /* t: less between an obstacle's own faces is none */

static int clothi_untangle_lets(const cloth_collide *c, int kind, int a, int b);

/* A pair is exempt when it is listed, when it belongs to an exempt pair of faces, or to a tangle
 * that is moved. */
static int clothi_is_exempt(const cloth_collide *c, int kind, int a, int b) {
    clothi_couple p;
    int           i, flip, there;
    p.kind = kind, p.a = a, p.b = b;
    (void)clothi_exempt_find(c, &p, &there);
    if (there) return 1;
    for (i = 0; i < c->nnow; i++)
        for (flip = 0; flip < 2 && c->now[i].kind < 0; flip++) {
            const int f = flip ? c->now[i].b : c->now[i].a;
            const int g = flip ? c->now[i].a : c->now[i].b;
            if (kind == CLOTHI_VF && g == b && clothi_face_has(c, f, a)) return 1;
            if (kind == CLOTHI_EE && clothi_face_has(c, f, c->edges[2 * a]) &&
                clothi_face_has(c, f, c->edges[2 * a + 1]) &&
                clothi_face_has(c, g, c->edges[2 * b]) &&
                clothi_face_has(c, g, c->edges[2 * b + 1]))
                return 1;
        }
    return c->untangle && clothi_untangle_lets(c, kind, a, b);
}

/* The distances of one pair at the start of the substep. */
typedef struct clothi_guard {
    double radius, separation, gap;         /* m; separation and gap without the radius        */
    double start;                           /* m, distance at x^n, radius taken off            */
} clothi_guard;

static clothi_guard clothi_guard_of(const cloth_collide *c, int kind, int a, int b, const int *v,
                                    const double *xa) {
    clothi_guard g;
    double       w[4], t = clothi_pair_thickness(c, kind, v);
    g.radius = clothi_pair_radius(c, kind, a, b);
    g.start = clothi_pair_distance(kind, xa, w) - g.radius;
    g.separation = clothi_min(CLOTHI_SEPARATION * t,
                              (c->opens > 0 ? CLOTHI_NEARER : CLOTHI_APPROACH) * g.start);
    g.gap = CLOTHI_GAP * t;
    return g;
}

static cloth_status clothi_row_add(cloth_collide *c, const clothi_row *row) {
    cloth_status status = clothi_grow(c->hooks, (void **)&c->row, c->nrow, &c->row_cap,
                                      sizeof *c->row);
    if (!status) c->row[c->nrow++] = *row;
    return status;
}

/* bound and speed of a row whose frame is known; `held` m: gap along n at x^n, radius off */
static void clothi_row_bound(const cloth_collide *c, const clothi_guard *g, double held,
                             clothi_row *row) {
    const double gap = clothi_min(g->gap, clothi_max(held + c->opens, 1.1 * g->separation));
    int          i, k;
    row->gap = g->start;
    row->bound = g->radius + gap;
    row->slack = gap - g->separation;
    for (i = 0; i < row->n; i++)
        for (k = 0; row->v[i] >= c->nv && k < 3; k++) {
            const double a = c->xa[3 * row->v[i] + k], b = c->xb[3 * row->v[i] + k];
            row->bound -= row->w[i] * row->normal[k] * b;
            row->speed -= row->w[i] * row->normal[k] * (b - a) / c->h;
        }
    row->key = clothi_key_of(c, row->kind, row->a, row->b, row->normal);
    row->zone = -1;
}

/* A pair that touches at x^n and is not exempt has no side to be kept on: rounding took its gap. */
static cloth_status clothi_no_side(cloth_collide *c, int kind, int a, int b) {
    cloth_status status = clothi_grow(c->hooks, (void **)&c->failed, 0, &c->failed_cap,
                                      sizeof *c->failed);
    if (status) return status;
    c->failed[0] = clothi_public_pair(c, kind, a, b);
    c->nfailed = 1;
    return clothi_fail(c->hooks, CLOTH_ERR_STEP, "contact: %s %i and %s %i have no gap at t = %g s",
                       kind == CLOTHI_EE ? "edge" : "vertex", c->failed[0].a,
                       kind == CLOTHI_EE ? "edge" : "face", c->failed[0].b, c->sim->state.t);
}

/* Looks at one pair over the substep; *hit counts, a row is added. */
static cloth_status clothi_detect_pair(cloth_collide *c, const clothi_couple *p, int *hit) {
    clothi_row   row;
    clothi_guard g;
    double       xa[12], xb[12], toi, held, r = clothi_pair_radius(c, p->kind, p->a, p->b);
    int        (*ccd)(const double *, const double *, double, double *) =
        p->kind == CLOTHI_EE ? cloth_ccd_ee : cloth_ccd_vf;
    memset(&row, 0, sizeof row);
    row.kind = p->kind, row.a = p->a, row.b = p->b;
    row.n = clothi_pair_vertices(c, p->kind, p->a, p->b, row.v);
    clothi_gather_points(c->xa, row.v, 4, xa);
    clothi_gather_points(c->xb, row.v, 4, xb);
    if (!ccd(xa, xb, r + CLOTHI_SEPARATION * c->desc.thickness, &toi)) return CLOTH_OK;
    g = clothi_guard_of(c, p->kind, p->a, p->b, row.v, xa);
    if (clothi_is_exempt(c, p->kind, p->a, p->b)) return CLOTH_OK;
    if (!(g.start > 0)) return clothi_no_side(c, p->kind, p->a, p->b);
    if (g.separation < CLOTHI_SEPARATION * c->desc.thickness &&
        !ccd(xa, xb, r + g.separation, &toi))
        return CLOTH_OK;
    held = clothi_contact_frame(p->kind == CLOTHI_EE, xa, xb, toi, row.w, row.normal);
    if (c->nin && clothi_leaves(c, p->kind, p->a, p->b, row.w, row.normal)) return CLOTH_OK;
    clothi_row_bound(c, &g, held - r, &row);
    ++*hit;
    return clothi_row_add(c, &row);
}

/* Cloth vertices that have moved against a plane: its distance is linear in time. */
static cloth_status clothi_detect_plane(cloth_collide *c, int slot, int *hit) {
    const clothi_obstacle *o = c->obstacle + slot;
    cloth_status status = CLOTH_OK;
    int          i, k;
    for (i = 0; i < c->nv && !status; i++) {
        clothi_row   row;
        clothi_guard g;
        double       end = 0;
        if (!c->moved[i] || !clothi_may_touch(c, -1, c->vertex_part[i], slot, 0)) continue;
        memset(&row, 0, sizeof row);
        g.radius = g.start = 0;
        g.gap = CLOTHI_GAP * c->desc.thickness;
        for (k = 0; k < 3; k++) {
            g.start += o->normal[k] * (c->xa[3 * i + k] - c->xa[3 * o->v0 + k]);
            end += o->normal[k] * (c->xb[3 * i + k] - c->xb[3 * o->v0 + k]);
        }
        g.separation = clothi_min(CLOTHI_SEPARATION * c->desc.thickness,
                                  (c->opens > 0 ? CLOTHI_NEARER : CLOTHI_APPROACH) * g.start);
        if (end >= g.separation || clothi_is_exempt(c, CLOTHI_VP, i, slot)) continue;
        if (!(g.start > 0)) return clothi_no_side(c, CLOTHI_VP, i, slot);
        row.kind = CLOTHI_VP, row.a = i, row.b = slot;
        row.n = 2, row.v[0] = i, row.v[1] = o->v0;
        row.w[0] = 1, row.w[1] = -1;
        memcpy(row.normal, o->normal, sizeof row.normal);
        clothi_row_bound(c, &g, g.start, &row);
        ++*hit;
        status = clothi_row_add(c, &row);
    }
    return status;
}

static int clothi_pair_moved(const cloth_collide *c, const clothi_couple *p) {
    int v[4], i, n = clothi_pair_vertices(c, p->kind, p->a, p->b, v);
    for (i = 0; i < n; i++)
        if (v[i] < c->nv && c->moved[v[i]]) return 1;
    return 0;
}

#define CLOTHI_STRUCK_GRAIN 512             /* pairs a range                                   */
enum { CLOTHI_STRUCK_MOVED = 1, CLOTHI_STRUCK_NEAR = 2 };

/* Which pairs moved, and which of them come within t/4: nearly all of detection's work. */
static void clothi_struck_range(int begin, int end, int worker, void *ctx) {
    cloth_collide *c = (cloth_collide *)ctx;
    int            i;
    (void)worker;
    for (i = begin; i < end; i++) {
        const clothi_couple *p = c->pair + i;
        double xa[12], xb[12], toi, reach = clothi_pair_radius(c, p->kind, p->a, p->b);
        int    v[4];
        c->struck[i] = 0;
        if (!clothi_pair_moved(c, p)) continue;
        c->struck[i] = CLOTHI_STRUCK_MOVED;
        (void)clothi_pair_vertices(c, p->kind, p->a, p->b, v);
        clothi_gather_points(c->xa, v, 4, xa);
        clothi_gather_points(c->xb, v, 4, xb);
        reach += CLOTHI_SEPARATION * c->desc.thickness;
        if (p->kind == CLOTHI_EE ? cloth_ccd_ee(xa, xb, reach, &toi)
                                 : cloth_ccd_vf(xa, xb, reach, &toi))
            c->struck[i] |= CLOTHI_STRUCK_NEAR;
    }
}

static cloth_status clothi_struck_pairs(cloth_collide *c) {
    if (c->npair > c->struck_cap) {
        clothi_free(c->hooks, c->struck);
        c->struck_cap = 0;
        c->struck = (unsigned char *)clothi_alloc(c->hooks, (size_t)c->pair_cap, 1);
        if (!c->struck)
            return clothi_fail(c->hooks, CLOTH_ERR_MEMORY, "no memory for %i pairs", c->npair);
        c->struck_cap = c->pair_cap;
    }
    clothi_for(c->hooks, c->npair, CLOTHI_STRUCK_GRAIN, clothi_struck_range, c);
    return CLOTH_OK;
}

/* All impacts of what moved since the last pass, in the order of the pairs. */
static cloth_status clothi_detect(cloth_collide *c, int *hit) {
    cloth_status status = clothi_inside_again(c);
    int          i;
    *hit = 0;
    if (!status) status = clothi_candidates(c, 1, CLOTHI_SEPARATION * c->desc.thickness);
    if (!status) status = clothi_struck_pairs(c);
    for (i = 0; i < c->npair && !status; i++) {
        c->report.candidates += c->struck[i] & CLOTHI_STRUCK_MOVED;
        if (c->struck[i] & CLOTHI_STRUCK_NEAR)
            status = clothi_detect_pair(c, c->pair + i, hit);
    }
    for (i = 0; i < c->nobstacle && !status; i++)
        if (c->obstacle[i].used && c->obstacle[i].kind == CLOTH_OBSTACLE_PLANE)
            status = clothi_detect_plane(c, i, hit);
    c->report.impacts += *hit;
    return status;
}

/* --- zones --- */

static int clothi_movable(const cloth_collide *c, int v) {
    return v < c->nv && !c->frozen[v] && (c->sim->pin[v] & CLOTH_AXIS_ALL) != CLOTH_AXIS_ALL;
}

static int clothi_zone_root(int *parent, int v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
}

/* Numbers the zones 0 .. *nzone-1 in the order of their first row; zone[v] of every vertex. Rows
 * without a movable vertex get zone -1. */
static void clothi_zone_number(cloth_collide *c, int *nzone) {
    int *parent = c->zone_of, *number = c->zone_number, i, k, root;
    for (i = 0; i < c->nv; i++) parent[i] = i, number[i] = -1;
    for (i = 0; i < c->nrow; i++) {
        int first = -1;
        for (k = 0; k < c->row[i].n && !c->row[i].gone; k++) {
            const int v = c->row[i].v[k];
            if (!clothi_movable(c, v)) continue;
            root = clothi_zone_root(parent, v);
            if (first < 0) first = root;
            if (root < first) parent[first] = root, first = root;
            if (root > first) parent[root] = first;
        }
    }
    *nzone = 0;
    for (i = 0; i < c->nrow; i++) {
        c->row[i].zone = -1;
        for (k = 0; k < c->row[i].n && c->row[i].zone < 0 && !c->row[i].gone; k++) {
            if (!clothi_movable(c, c->row[i].v[k])) continue;
            root = clothi_zone_root(parent, c->row[i].v[k]);
            if (number[root] < 0) number[root] = (*nzone)++;
            c->row[i].zone = number[root];
        }
    }
}

#define CLOTHI_RIGID_PASSES 20              /* more, after the last QP                         */
#define CLOTHI_EXACT_ROWS   200             /* larger zones are swept                          */
#define CLOTHI_SWEEPS       300
#define CLOTHI_SWEPT_PASSES 12              /* in which unfinished sweeps may go on            */
#define CLOTHI_LET_GO       3               /* the same where an obstacle may let go           */
#define CLOTHI_CALM         0.25            /* of the motion that is not rigid                 */
#define CLOTHI_CALMS        2               /* of a substep, before zones become rigid         */
#define CLOTHI_EXACT_MOST   1000            /* rows; more take the exact QP minutes            */
#define CLOTHI_EXACT_SETS   400             /* tried before a zone becomes rigid               */

static void clothi_zone_free(cloth_collide *c) {
    const cloth_hooks *k = c->hooks;
    clothi_free(k, c->zone_start);
    clothi_free(k, c->zone_cursor);
    clothi_free(k, c->zone_order);
    clothi_free(k, c->qp_row);
    clothi_free(k, c->qp_col);
    clothi_free(k, c->qp_val);
    clothi_free(k, c->qp_h);
    clothi_free(k, c->qp_lambda);
    clothi_free(k, c->qp_guess);
    clothi_free(k, c->qp_norm);
    c->zone_start = c->zone_cursor = c->zone_order = c->qp_row = c->qp_col = NULL;
    c->qp_val = c->qp_h = c->qp_lambda = c->qp_guess = c->qp_norm = NULL;
    c->zone_cap = 0;
}

/* Room for what zones need: one entry a row, twelve numbers a row. */
static cloth_status clothi_zone_reserve(cloth_collide *c) {
    const size_t n = (size_t)c->row_cap;
    if (c->zone_cap >= c->row_cap) return CLOTH_OK;
    clothi_zone_free(c);
    c->zone_start = (int *)clothi_alloc(c->hooks, n + 1, sizeof(int));
    c->zone_cursor = (int *)clothi_alloc(c->hooks, n + 1, sizeof(int));
    c->zone_order = (int *)clothi_alloc(c->hooks, n, sizeof(int));
    c->qp_row = (int *)clothi_alloc(c->hooks, n + 1, sizeof(int));
    c->qp_col = (int *)clothi_alloc(c->hooks, 12 * n, sizeof(int));
    c->qp_val = (double *)clothi_alloc(c->hooks, 12 * n, sizeof(double));
    c->qp_h = (double *)clothi_alloc(c->hooks, n, sizeof(double));
    c->qp_lambda = (double *)clothi_alloc(c->hooks, n, sizeof(double));
    c->qp_guess = (double *)clothi_alloc(c->hooks, n, sizeof(double));
    c->qp_norm = (double *)clothi_alloc(c->hooks, n, sizeof(double));
    if (!c->zone_start || !c->zone_cursor || !c->zone_order || !c->qp_row || !c->qp_col ||
        !c->qp_val || !c->qp_h || !c->qp_lambda || !c->qp_guess || !c->qp_norm) {
        clothi_zone_free(c);
        return CLOTH_ERR_MEMORY;
    }
    c->zone_cap = c->row_cap;
    return CLOTH_OK;
}

/* Rows of each zone, in their order: zone_order[zone_start[z] .. zone_cursor[z]). */
static void clothi_zone_rows(cloth_collide *c, int nzone) {
    int i;
    for (i = 0; i <= nzone; i++) c->zone_start[i] = 0;
    for (i = 0; i < c->nrow; i++)
        if (c->row[i].zone >= 0) c->zone_start[c->row[i].zone + 1]++;
    for (i = 0; i < nzone; i++) c->zone_start[i + 1] += c->zone_start[i];
    for (i = 0; i < nzone; i++) c->zone_cursor[i] = c->zone_start[i];
    for (i = 0; i < c->nrow; i++)
        if (c->row[i].zone >= 0) c->zone_order[c->zone_cursor[c->row[i].zone]++] = i;
}

/* The zone's QP: unknowns are the movable vertices of its rows, 3 each; what is pinned on an axis
 * has minv 0 there. `from` [nv x 3] is x0; speeds: rows on velocities. Returns the unknowns. */
static int clothi_zone_qp(cloth_collide *c, int z, const double *from, int speeds, cloth_qp *qp) {
    const double *mass = c->sim->params.mass;
    int    begin = c->zone_start[z], end = c->zone_cursor[z], m = 0, nnz = 0, n = 0, r, i, k;
    double mean = 0;
    for (r = begin; r < end; r++) {
        const clothi_row *row = c->row + c->zone_order[r];
        if (speeds && !(row->multiplier > 0)) continue;
        c->qp_row[m] = nnz;
        c->qp_h[m] = speeds ? -row->speed : -row->bound;
        for (i = 0; i < row->n; i++) {
            const int v = row->v[i];
            if (v >= c->nv) continue;
            if (!clothi_movable(c, v)) {
                for (k = 0; k < 3; k++) {
                    double at = from[3 * v + k];
                    if (c->frozen[v])
                        at = speeds ? (c->xb[3 * v + k] - c->xa[3 * v + k]) / c->h
                                    : c->xb[3 * v + k];
                    c->qp_h[m] += row->w[i] * row->normal[k] * at;
                }
                continue;
            }
            if (c->local[v] < 0) {
                c->local[v] = n;
                c->member[n++] = v;
            }
            for (k = 0; k < 3; k++) {
                c->qp_col[nnz] = 3 * c->local[v] + k;
                c->qp_val[nnz++] = -row->w[i] * row->normal[k];
            }
        }
        c->qp_lambda[m++] = 0;
    }
    c->qp_row[m] = nnz;
    for (i = 0; i < n; i++) mean += mass[c->member[i]] / n;
    for (i = 0; i < n; i++) {
        const int v = c->member[i];
        for (k = 0; k < 3; k++) {
            c->qp_minv[3 * i + k] = c->sim->pin[v] >> k & 1 ? 0 : mean / mass[v];
            c->qp_x0[3 * i + k] = from[3 * v + k];
        }
        c->local[v] = -1;
    }
    memset(qp, 0, sizeof *qp);
    qp->n = 3 * n, qp->m = m;
    qp->minv = c->qp_minv, qp->x0 = c->qp_x0;
    qp->row = c->qp_row, qp->col = c->qp_col, qp->val = c->qp_val, qp->h = c->qp_h;
    c->mean_mass = mean;
    return n;
}

/* Lets row r of the QP have its way: lambda, and x with it. Returns how far it moved, m. */
static double clothi_sweep_row(cloth_collide *c, const cloth_qp *qp, int r) {
    const double a = c->qp_norm[r];
    double       w = qp->h[r], d;
    int          i;
    for (i = qp->row[r]; i < qp->row[r + 1]; i++) w -= qp->val[i] * c->qp_x[qp->col[i]];
    if (!(a > 0)) return w < 0 ? HUGE_VAL : 0;
    d = clothi_max(-w / a, -c->qp_lambda[r]);
    if (!(d < 0 || d > 0)) return 0;
    c->qp_lambda[r] += d;
    for (i = qp->row[r]; i < qp->row[r + 1]; i++)
        c->qp_x[qp->col[i]] -= d * qp->minv[qp->col[i]] * qp->val[i];
    return fabs(d) * a;
}

/* The QP of zone z by sweeps over its rows, there and back, from the multipliers in qp_lambda,
 * until none moves by `enough` (0: by a tenth of its slack). Of four sweeps one takes all rows, the
 * others those that push. 1 when that came. */
static int clothi_zone_sweeps(cloth_collide *c, int z, const cloth_qp *qp, double enough) {
    const int *order = c->zone_order + c->zone_start[z];
    int        sweep, i, j, r;
    for (i = 0; i < qp->n; i++) c->qp_x[i] = qp->x0[i];
    for (r = 0; r < qp->m; r++)
        for (c->qp_norm[r] = 0, i = qp->row[r]; i < qp->row[r + 1]; i++) {
            const double g = qp->val[i] * qp->minv[qp->col[i]];
            c->qp_norm[r] += g * qp->val[i];
            c->qp_x[qp->col[i]] -= c->qp_lambda[r] * g;
        }
    for (sweep = 0; sweep < CLOTHI_SWEEPS; sweep++) {
        const int all = sweep % 4 == 0;
        int       late = 0;
        for (j = 0; j < qp->m; j++) {
            r = sweep & 1 ? qp->m - 1 - j : j;
            if (!all && !(c->qp_lambda[r] > 0)) continue;
            late += clothi_sweep_row(c, qp, r) >
                    (enough > 0 ? enough : 0.1 * c->row[order[r]].slack);
        }
        c->report.qp_iterations++;
        if (!late && all) return 1;
    }
    return 0;
}

/* Numbers so large that the program refuses them: the zone is not solved, nothing else is wrong. */
static int clothi_qp_absurd(cloth_status status) {
    return status == CLOTH_ERR_ARGUMENT || status == CLOTH_ERR_NONFINITE ||
           status == CLOTH_ERR_CAPACITY;
}

/* Solves zone z from x_IE into xb; *solved 0: infeasible or too hard. */
static cloth_status clothi_zone_solve(cloth_collide *c, int z, int first, int *solved) {
    cloth_qp        qp;
    cloth_qp_report rep;
    cloth_status    status = CLOTH_OK;
    double          push = 0, mass = 0;
    int             n = clothi_zone_qp(c, z, c->x_ie, 0, &qp), i, k, r, swept;
    memset(&rep, 0, sizeof rep);
    for (r = 0; r < qp.m; r++) {            /* what the last pass found; the new rows may hold */
        const int row = c->zone_order[c->zone_start[z] + r];
        c->qp_guess[r] = row >= first ? 1 : c->row[row].multiplier;
        c->qp_lambda[r] = row >= first ? 0 : c->row[row].multiplier / c->mean_mass;
    }
    c->report.largest_zone = qp.m > c->report.largest_zone ? qp.m : c->report.largest_zone;
    swept = qp.m > CLOTHI_EXACT_ROWS;
    *solved = swept && (clothi_zone_sweeps(c, z, &qp, 0) ||
                        c->report.passes - c->calm_pass <=
                            (c->lets_go ? CLOTHI_LET_GO : CLOTHI_SWEPT_PASSES));
    if (!*solved && qp.m <= CLOTHI_EXACT_MOST) {        /* also what sweeps cannot end */
        if (swept) memcpy(c->qp_guess, c->qp_lambda, (size_t)qp.m * sizeof(double));
        c->qp_options.guess = first > 0 || swept ? c->qp_guess : NULL;
        c->qp_options.max_iterations = CLOTHI_EXACT_SETS;
        status = cloth_qp_solve(&qp, &c->qp_options, c->qp_x, c->qp_lambda, &rep);
        c->qp_options.guess = NULL;
        c->report.qp_iterations += rep.iterations;
        if (clothi_qp_absurd(status)) status = CLOTH_OK;
        *solved = !status && rep.outcome == CLOTH_QP_SOLVED;
    }
    if (status || !*solved) return status;
    for (i = 0; i < n; i++) {
        const int    v = c->member[i];
        const double m = c->sim->params.mass[v];
        for (k = 0; k < 3; k++) {
            const double d = c->qp_x[3 * i + k] - c->x_ie[3 * v + k];
            push += m * d * d;
        }
        mass += m;
    }
    for (r = 0; r < qp.m; r++)
        c->row[c->zone_order[c->zone_start[z] + r]].multiplier = c->qp_lambda[r] * c->mean_mass;
    push = sqrt(push / mass);
    *solved = push <= c->desc.max_push;
    if (!*solved) return CLOTH_OK;
    c->report.push = clothi_max(c->report.push, push);
    for (i = 0; i < 3 * n; i++) {
        double *x = c->xb + 3 * c->member[i / 3] + i % 3;
        if (c->qp_x[i] < *x || c->qp_x[i] > *x) c->moved[c->member[i / 3]] = 1;
        *x = c->qp_x[i];
    }
    return CLOTH_OK;
}

#define CLOTHI_RELEASES 12                  /* of one zone in a pass                           */

#define CLOTHI_NAMED    1e-3                /* of the largest multiplier                       */

/* 1 when vertex p of an obstacle lies farther out on it than q by more than a limb: p yields. */
static int clothi_outer(const cloth_collide *c, int p, int q) {
    const clothi_obstacle *o = c->obstacle + c->slot[p], *u = c->obstacle + c->slot[q];
    const clothi_inside   *k = o->inside;
    int                    a, b;
    if (o != u || !k->rank) return 0;
    p -= o->v0, q -= o->v0;
    a = k->part_of[p], b = k->part_of[q];
    if (a != b) return k->size_of[a] != k->size_of[b] ? k->size_of[a] < k->size_of[b] : a > b;
    return 3 * (k->mid[p] - k->mid[q]) > k->slack[a];
}

/* The rows of zone z contradict each other, and c->qp_lambda is the certificate, or they push too
 * hard. What the multipliers name of an obstacle that penetrates itself lets go for this step,
 * with the faces around it: there cloth is pinched between parts of one body. Returns 0 when there
 * is nothing of the kind. */
static int clothi_zone_release(cloth_collide *c, int z) {
    const int m = c->zone_cursor[z] - c->zone_start[z];
    double    most = 0;
    int       r, i, k, pass, found = 0, holds = -1;
    for (r = 0; r < m; r++) most = clothi_max(most, c->qp_lambda[r]);
    for (pass = 0; pass < 3 && !found; pass++)      /* who holds; who yields to it; else all */
        for (r = 0; r < m; r++) {
            const clothi_row *row = c->row + c->zone_order[c->zone_start[z] + r];
            const int         slot = clothi_pair_slot(c, row->kind, row->a, row->b);
            if (!(c->qp_lambda[r] > CLOTHI_NAMED * most)) continue;
            for (k = 0; slot >= 0 && c->obstacle[slot].inside && k < row->n; k++) {
                const int v = row->v[k];
                if (v < c->nv || c->off_v[v]) continue;
                if (pass == 0) holds = holds < 0 || clothi_outer(c, holds, v) ? v : holds;
                else if (pass == 2 || clothi_outer(c, v, holds)) c->off_v[v] = 2, found = 1;
            }
        }
    for (i = c->nf; found && i < c->mf; i++)
        for (k = 0; k < 3 && !c->off[i]; k++)
            if (c->off_v[c->faces[3 * i + k]] == 2)
                c->off[i] = CLOTHI_OFF, c->report.exempt_faces++;
    if (found) clothi_inside_edges_off(c);
    for (r = 0; found && r < c->nrow; r++) {
        clothi_row *row = c->row + r;
        if (row->kind == CLOTHI_VF && row->b >= c->nf) row->gone |= c->off[row->b];
        else if (row->kind == CLOTHI_EE) row->gone |= c->off_e[row->a] || c->off_e[row->b];
        else
            for (k = 0; k < row->n; k++) row->gone |= c->off_v[row->v[k]] != 0;
        if (row->gone) row->multiplier = 0;
    }
    for (r = i = c->zone_start[z]; found && r < c->zone_cursor[z]; r++)
        if (!c->row[c->zone_order[r]].gone) c->zone_order[i++] = c->zone_order[r];
    if (found) c->zone_cursor[z] = i;
    return found;
}

/* Mean motion of the obstacles that a zone touches; 0: it touches none and nothing is pinned. */
static int clothi_zone_carrier(const cloth_collide *c, int z, double *motion) {
    double weight = 0;
    int    r, i, k, held = 0;
    motion[0] = motion[1] = motion[2] = 0;
    for (r = c->zone_start[z]; r < c->zone_cursor[z]; r++) {
        const clothi_row *row = c->row + c->zone_order[r];
        for (i = 0; i < row->n; i++) {
            const int v = row->v[i];
            if (v < c->nv && !c->sim->pin[v] && !c->frozen[v]) continue;
            held = 1;
            weight += fabs(row->w[i]);
            for (k = 0; k < 3; k++)
                motion[k] += fabs(row->w[i]) * (c->xb[3 * v + k] - c->xa[3 * v + k]);
        }
    }
    for (k = 0; k < 3 && weight > 0; k++) motion[k] /= weight;
    return held;
}

/* Inverse of the symmetric A [3x3] times b; 0: singular. */
static int clothi_solve3(const double *A, const double *b, double *x) {
    double c[3][3], det;
    int    k;
    clothi_cross3(A + 3, A + 6, c[0]);
    clothi_cross3(A + 6, A, c[1]);
    clothi_cross3(A, A + 3, c[2]);
    det = clothi_dot3(A, c[0]);
    if (!(fabs(det) > 1e-12 * pow(fabs(A[0]) + fabs(A[4]) + fabs(A[8]), 3))) return 0;
    for (k = 0; k < 3; k++) x[k] = (c[0][k] * b[0] + c[1][k] * b[1] + c[2][k] * b[2]) / det;
    return 1;
}

/* member [n]: as one rigid body from xa with the momentum and the angular momentum of x_IE. */
static void clothi_zone_rotate(cloth_collide *c, int n) {
    const double *mass = c->sim->params.mass;
    double center[3] = {0, 0, 0}, move[3] = {0, 0, 0}, total = 0, L[3] = {0, 0, 0};
    double I[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}, turn[3] = {0, 0, 0}, angle, s, t;
    int    i, j, k;
    for (i = 0; i < n; i++) {
        const int v = c->member[i];
        total += mass[v];
        for (k = 0; k < 3; k++) {
            center[k] += mass[v] * c->xa[3 * v + k];
            move[k] += mass[v] * (c->x_ie[3 * v + k] - c->xa[3 * v + k]);
        }
    }
    for (k = 0; k < 3; k++) center[k] /= total, move[k] /= total;
    for (i = 0; i < n; i++) {
        const int    v = c->member[i];
        const double m = mass[v];
        double       r[3], d[3], l[3];
        for (k = 0; k < 3; k++) {
            r[k] = c->xa[3 * v + k] - center[k];
            d[k] = c->x_ie[3 * v + k] - c->xa[3 * v + k];
        }
        clothi_cross3(r, d, l);
        for (k = 0; k < 3; k++) {
            L[k] += m * l[k];
            for (j = 0; j < 3; j++)
                I[3 * k + j] += m * ((k == j ? clothi_dot3(r, r) : 0) - r[k] * r[j]);
        }
    }
    if (!clothi_solve3(I, L, turn)) turn[0] = turn[1] = turn[2] = 0;
    angle = sqrt(clothi_dot3(turn, turn));
    s = angle > 1e-9 ? sin(angle) / angle : 1;
    t = angle > 1e-9 ? (1 - cos(angle)) / (angle * angle) : 0.5;
    for (i = 0; i < n; i++) {               /* Rodrigues */
        const int v = c->member[i];
        double    r[3], p[3], q[3];
        for (k = 0; k < 3; k++) r[k] = c->xa[3 * v + k] - center[k];
        clothi_cross3(turn, r, p);
        clothi_cross3(turn, p, q);
        for (k = 0; k < 3; k++)
            c->xb[3 * v + k] = center[k] + move[k] + r[k] + s * p[k] + t * q[k];
    }
}

/* A zone becomes rigid, frozen 1: with its momentum or its carrier; 2: where it was. */
static void clothi_zone_freeze(cloth_collide *c, int z, int level) {
    double motion[3];
    int    held = clothi_zone_carrier(c, z, motion), n = 0, r, i, k;
    for (r = c->zone_start[z]; r < c->zone_cursor[z]; r++) {
        clothi_row *row = c->row + c->zone_order[r];
        row->multiplier = 0;
        for (i = 0; i < row->n; i++) {
            if (!clothi_movable(c, row->v[i]) || c->local[row->v[i]] >= 0) continue;
            c->local[row->v[i]] = n;
            c->member[n++] = row->v[i];
        }
    }
    if (!held && level == 1) clothi_zone_rotate(c, n);
    for (i = 0; i < n; i++) {
        const int v = c->member[i];
        for (k = 0; held && k < 3; k++)
            if (!(c->sim->pin[v] >> k & 1)) c->xb[3 * v + k] = c->xa[3 * v + k] + motion[k];
        for (k = 0; level == 2 && k < 3; k++)
            if (!(c->sim->pin[v] >> k & 1)) c->xb[3 * v + k] = c->xa[3 * v + k];
        c->local[v] = -1;
        c->moved[v] = 1;
        c->frozen[v] = (unsigned char)level;
    }
    c->report.rigid_zones++;
}

/* The motion of zone z that is not rigid is cut to CLOTHI_CALM of it, and its rows are forgotten:
 * they were about ways that nothing takes now. Momentum stays as in a rigid zone. */
static void clothi_zone_calm(cloth_collide *c, int z) {
    int r, i, k;
    clothi_zone_freeze(c, z, 1);
    c->report.rigid_zones--;
    for (r = c->zone_start[z]; r < c->zone_cursor[z]; r++) {
        clothi_row *row = c->row + c->zone_order[r];
        row->gone = 1;
        for (i = 0; i < row->n; i++) {
            const int v = row->v[i];
            if (v >= c->nv || !c->frozen[v] || !c->moved[v]) continue;
            c->frozen[v] = 0;
            for (k = 0; k < 3; k++) {
                double *x = c->xb + 3 * v + k;
                *x += CLOTHI_CALM * (c->x_ie[3 * v + k] - *x);
                c->x_ie[3 * v + k] = *x;
            }
        }
    }
}

/* A hit among rigid zones alone: they stay where they were. 0: nothing is left to try. */
static int clothi_still(cloth_collide *c, const clothi_row *row) {
    int i, k, v, found = 0;
    for (i = 0; i < row->n; i++) {
        v = row->v[i];
        if (v >= c->nv || c->frozen[v] != 1) continue;
        found = 1;
        for (k = 0; k < 3; k++)
            if (!(c->sim->pin[v] >> k & 1)) c->xb[3 * v + k] = c->xa[3 * v + k];
        c->frozen[v] = 2;
        c->moved[v] = 1;
    }
    return found;
}

/* Lists the impacts from row `first` on as what could not be resolved. */
static cloth_status clothi_failed_pairs(cloth_collide *c, int first) {
    int i;
    c->nfailed = 0;
    for (i = first; i < c->nrow; i++) {
        cloth_status status = clothi_grow(c->hooks, (void **)&c->failed, c->nfailed,
                                          &c->failed_cap, sizeof *c->failed);
        if (status) return status;
        c->failed[c->nfailed++] = clothi_public_pair(c, c->row[i].kind, c->row[i].a, c->row[i].b);
    }
    return clothi_fail(c->hooks, CLOTH_ERR_STEP,
                       "contact: %i pairs could not be resolved in %i passes at t = %g s; the "
                       "first: %s %i and %s %i", c->nfailed, c->report.passes,
                       c->sim->state.t, c->failed[0].edge_edge ? "edge" : "vertex",
                       c->failed[0].a, c->failed[0].edge_edge ? "edge" : "face",
                       c->failed[0].b);
}

/* One round over the rows from `first` on, which are new. */
static cloth_status clothi_zones(cloth_collide *c, int first) {
    cloth_status status = clothi_zone_reserve(c);
    int          nzone, z, r, solved;
    if (status) return status;
    clothi_zone_number(c, &nzone);
    clothi_zone_rows(c, nzone);
    if (nzone > c->report.zones) c->report.zones = nzone;
    memset(c->moved, 0, (size_t)c->nv);
    for (r = first; r < c->nrow; r++)
        if (c->row[r].zone < 0 && !c->row[r].gone && !clothi_still(c, c->row + r))
            return clothi_failed_pairs(c, first);
    for (z = 0; z < nzone && !status; z++) {
        if (c->zone_order[c->zone_cursor[z] - 1] < first) continue;   /* nothing new in it */
        solved = 0;
        for (r = 0; r < CLOTHI_RELEASES && c->report.passes <= c->desc.max_passes; r++) {
            status = clothi_zone_solve(c, z, first, &solved);
            if (status || solved || !clothi_zone_release(c, z)) break;
        }
        if (status || solved) continue;
        if (c->calms < CLOTHI_CALMS || c->calm_pass == c->report.passes) {
            if (c->calm_pass < c->report.passes) c->calms++;
            c->calm_pass = c->report.passes;
            clothi_zone_calm(c, z);
        } else
            clothi_zone_freeze(c, z, 1);
    }
    return status;
}

/* member [n], of zone z: the mean velocity of the step; free of obstacles with v's momentum. */
static void clothi_zone_mean(cloth_collide *c, int z, int n, double *v) {
    const double *mass = c->sim->params.mass;
    double        shift[3] = {0, 0, 0}, total = 0, motion[3];
    const int     held = clothi_zone_carrier(c, z, motion);
    int           i, k;
    for (i = 0; i < n; i++) {
        const size_t at = 3 * (size_t)c->member[i];
        total += mass[c->member[i]];
        for (k = 0; k < 3; k++) {
            const double mean = (c->xb[at + (size_t)k] - c->xa[at + (size_t)k]) / c->h;
            shift[k] += mass[c->member[i]] * (v[at + (size_t)k] - mean);
            v[at + (size_t)k] = mean;
        }
    }
    for (i = 0; i < 3 * n && !held; i++)
        v[3 * c->member[i / 3] + i % 3] += shift[i % 3] / total;
}

/* Velocities of an explicit step: the mean ones where rows are active, then min 1/2 |v - v*|^2_M
 * with no approach on those rows. */
static cloth_status clothi_zone_speeds(cloth_collide *c, double *v) {
    cloth_status status = CLOTH_OK;
    int          nzone, z, i, k;
    clothi_zone_number(c, &nzone);
    clothi_zone_rows(c, nzone);
    for (z = 0; z < nzone && !status; z++) {
        cloth_qp        qp;
        cloth_qp_report rep;
        int             n = clothi_zone_qp(c, z, v, 1, &qp);
        memset(&rep, 0, sizeof rep);
        if (qp.m == 0) continue;
        clothi_zone_mean(c, z, n, v);
        for (i = 0; i < 3 * n; i++) c->qp_x0[i] = v[3 * c->member[i / 3] + i % 3];
        if (qp.m > CLOTHI_EXACT_ROWS)
            (void)clothi_zone_sweeps(c, z, &qp, 0.01 * c->desc.thickness / c->h);
        else
            status = cloth_qp_solve(&qp, &c->qp_options, c->qp_x, c->qp_lambda, &rep);
        if (clothi_qp_absurd(status)) status = CLOTH_OK;
        if (status || (qp.m <= CLOTHI_EXACT_ROWS && rep.outcome != CLOTH_QP_SOLVED)) continue;
        for (i = 0; i < n; i++)
            for (k = 0; k < 3; k++) v[3 * c->member[i] + k] = c->qp_x[3 * i + k];
    }
    for (i = 0; i < c->nv; i++)             /* what became rigid moves as it moved */
        for (k = 0; c->frozen[i] && k < 3; k++)
            v[3 * i + k] = (c->xb[3 * i + k] - c->xa[3 * i + k]) / c->h;
    return status;
}

/* ===== [8.4] THE CONTACT IN THE STEP =========================================================
 *
 *   begin    poses of the substep; pairs in range at x^n -> touches, with what anchors remember
 *   eval     E_col and friction of the touches, in every Newton iterate                    [8.2]
 *   resolve  detection and zones from x^n to the candidate; the anchors move on            [8.3]
 *   commit   the step is accepted: poses and anchors become state; what has parted is exempt no
 *            more                                   rollback  nothing has happened
 *
 * What the ledger gets: with p the pull of a touch on sum w x (normal and tangential part p_n, p_t)
 * at the minimiser, du the motion of sum w x, b its obstacle's part, and l/h^2 the force of a row,
 *     contact        sum k (t - g)^3/(3 t): no part of the total, for a pair comes into range with
 *                    it; what the damping leaves of it does contact_work later. So is what the
 *                    triangles pressed flat hold
 *     contact_work   sum -p_n.du + p.b, the work of triangles pressed flat, and what obstacles that
 *                    move give through the rows: -l/h^2 n.b; pins in a row are booked as pin_work
 *     friction_loss  sum p_t.du, the anchors' give with it: 2/3 mu N slip at most, may return
 *     zone_loss      energy at the minimiser with v = (x - x^n)/h less that after the zones, and
 *                    the work through the rows: the speed of approach, less the strain that their
 *                    push brings in, which outweighs it where cloth is stiff
 * What is left as numerical_loss is what the integrator loses without contact.
 *
 * State that hashes, snapshots and the next step see: poses and targets of obstacles, anchors,
 * exempt pairs, and a hash of x, by which a host's write to the state is noticed: then anchors
 * are dropped and intersections looked for anew.
 *
 * checked: tests/test_collide.c, tests/test_collide_state.c, tests/test_ledger.c (forces and
 *   ledger), tests/fuzz_obstacle.c */

static void clothi_anchor_sort(clothi_anchor *t, int n) {
    int start = n / 2, end = n, root, child;
    clothi_anchor swap;
    while (end > 1) {
        if (start > 0)
            start--;
        else {
            end--;
            swap = t[0], t[0] = t[end], t[end] = swap;
        }
        for (root = start; (child = 2 * root + 1) < end; root = child) {
            if (child + 1 < end && clothi_key_compare(&t[child].key, &t[child + 1].key) < 0)
                child++;
            if (clothi_key_compare(&t[root].key, &t[child].key) >= 0) break;
            swap = t[root], t[root] = t[child], t[child] = swap;
        }
    }
}

static cloth_status clothi_anchor_add(cloth_collide *c, const clothi_anchor *a) {
    cloth_status status = clothi_grow(c->hooks, (void **)&c->next, c->nnext, &c->next_cap,
                                      sizeof *c->next);
    if (!status) c->next[c->nnext++] = *a;
    return status;
}

/* Where friction left a leader's anchor at x: u cut to the slip length. */
static void clothi_anchor_slip(const cloth_collide *c, const clothi_touch *q, const double *x,
                               clothi_anchor *a) {
    double u[3], along, size;
    int    k;
    clothi_touch_motion(c, q, x, u);
    along = clothi_dot3(u, q->normal);
    for (k = 0; k < 3; k++) u[k] += q->slip[k] - along * q->normal[k];
    size = sqrt(clothi_dot3(u, u));
    a->sliding = size > c->desc.slip;
    for (k = 0; k < 3; k++) a->slip[k] = u[k] * (a->sliding ? c->desc.slip / size : 1);
}

/* What the substep leaves to the next one: an anchor for each key with a normal force. */
static cloth_status clothi_anchors_move(cloth_collide *c, const double *x) {
    cloth_status  status = CLOTH_OK;
    clothi_anchor a;
    int           i, n = 0;
    c->nnext = 0;
    for (i = 0; i < c->ntouch && !status; i++) {
        clothi_touch *q = c->touch + i;
        double        u[3];
        clothi_touch_motion(c, q, x, u);
        if (q->out) q->leader = 0;
        q->force = clothi_touch_force(c, q, q->gap + clothi_dot3(u, q->normal), NULL);
        memset(&a, 0, sizeof a);
        a.key = q->key;
        a.force = q->force;
        a.sliding = -1;                     /* not a leader */
        if (q->leader) clothi_anchor_slip(c, q, x, &a);
        if (!q->out && (q->leader || a.force > 0)) status = clothi_anchor_add(c, &a);
    }
    for (i = 0; i < c->nrow && !status; i++) {
        memset(&a, 0, sizeof a);
        a.key = c->row[i].key;
        a.force = c->row[i].multiplier / (c->h * c->h);
        a.sliding = -1;
        if (a.force > 0) status = clothi_anchor_add(c, &a);
    }
    if (status) return status;
    clothi_anchor_sort(c->next, c->nnext);
    for (i = 0; i < c->nnext; i++) {        /* one a key */
        if (n == 0 || clothi_key_compare(&c->next[n - 1].key, &c->next[i].key) != 0) {
            c->next[n++] = c->next[i];
            continue;
        }
        c->next[n - 1].force += c->next[i].force;
        if (c->next[i].sliding < 0) continue;
        memcpy(c->next[n - 1].slip, c->next[i].slip, sizeof a.slip);
        c->next[n - 1].sliding = c->next[i].sliding;
    }
    for (i = 0, c->nnext = 0; i < n; i++)
        if (c->next[i].force > 0) c->next[c->nnext++] = c->next[i];
    return CLOTH_OK;
}

static cloth_status clothi_touches_find(cloth_collide *c) {
    cloth_status status = clothi_candidates(c, 0, c->desc.thickness);
    int          i, o;
    c->ntouch = 0;
    for (i = 0; i < c->npair && !status; i++) {
        const clothi_couple *p = c->pair + i;
        const int            n = c->ntouch; /* few are in range: those are looked up */
        status = clothi_touch_add(c, p->kind, p->a, p->b);
        if (c->ntouch > n && (clothi_is_exempt(c, p->kind, p->a, p->b) ||
                              (c->nin && clothi_leaves(c, p->kind, p->a, p->b, c->touch[n].w,
                                                       c->touch[n].normal))))
            c->ntouch = n;
    }
    for (o = 0; o < c->nobstacle && !status; o++)
        for (i = 0; c->obstacle[o].used && clothi_is_wall(c->obstacle + o) && i < c->nv && !status;
             i++)
            if (clothi_may_touch(c, -1, c->vertex_part[i], o, 0))
                status = clothi_touch_add(c, CLOTHI_VP, i, o);
    if (!status && c->nout) status = clothi_ways_out(c);
    if (status) return status;
    clothi_touch_sort(c->touch, c->ntouch);
    clothi_touch_remember(c);
    return CLOTH_OK;
}

static uint64_t clothi_contact_seen(const cloth_collide *c) {
    return clothi_hash(0xcbf29ce484222325u, c->sim->state.x, 3 * (size_t)c->nv * sizeof(double));
}

/* The first substep of a step works on copies of what is state. */
static cloth_status clothi_contact_open(cloth_collide *c) {
    cloth_status status = CLOTH_OK;
    int          i, inside = 0;
    c->begun = 1;
    c->nfailed = 0;
    c->nnext = c->nnow = 0;
    if (c->seen != clothi_contact_seen(c))  /* a host wrote x: anchors are dropped */
        return clothi_contact_check(c);
    for (i = 0; i < c->nexempt && !status; i++)
        status = clothi_exempt_add(c, c->exempt[i].kind, c->exempt[i].a, c->exempt[i].b);
    for (i = 0; i < c->nobstacle && !inside; i++)
        inside = c->obstacle[i].used && c->obstacle[i].inside;
    if (!status && inside && c->desc.push_out > 0) clothi_inside_stays(c);
    if (!status && inside) status = clothi_crossings(c, 1);     /* faces that came out again */
    for (i = 0; i < c->nanchor && !status; i++) status = clothi_anchor_add(c, c->anchor + i);
    return status;
}

static cloth_status clothi_contact_begin(void *user, const cloth_eval *e) {
    cloth_collide *c = (cloth_collide *)user;
    cloth_sim     *s = c->sim;
    const double   start = clothi_now(c->hooks);
    const int      explicit_step = s->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG;
    cloth_status   status = CLOTH_OK;
    if (!(e->h > 0))
        return clothi_fail(c->hooks, CLOTH_ERR_UNSUPPORTED,
                           "cloth_solve_static: a sim with contact comes to rest by steps");
    c->h = e->h;
    c->v_n = e->v_n;
    c->opens = 0;
    if (explicit_step)
        c->opens = c->desc.thickness * clothi_min(0.25 * c->h / c->desc.relaxation, 0.1);
    clothi_world_pose(c, e->x_n, explicit_step ? 0 : s->attach_alpha - s->attach_step,
                      explicit_step ? 1 : s->attach_alpha);
    c->solid_known = 0;
    if (!c->begun) {
        memset(&c->report, 0, sizeof c->report);
        c->report.fraction = 1;
    }
    status = clothi_inside_faces(c);
    if (!status && !c->begun) status = clothi_contact_open(c);
    memset(&c->books, 0, sizeof c->books);
    c->ntouch = 0;
    c->nin = c->nout = 0;
    if (!status && !explicit_step && c->lets_go && c->desc.push_out > 0)
        status = clothi_insiders(c);
    if (!status && !explicit_step) status = clothi_touches_find(c);
    c->report.touches = c->ntouch;
    c->report.ms_begin += 1e3 * (clothi_now(c->hooks) - start);
    return status;
}

static cloth_status clothi_contact_update(void *user, const double *x) {
    cloth_collide *c = (cloth_collide *)user;
    int            i;
    for (i = 0; i < c->ntouch; i++)         /* touches are those of x^n */
        if (c->touch[i].limit > 0) clothi_touch_ease(c, c->touch + i, x);
    return CLOTH_OK;
}

static double clothi_contact_max_step(void *user, const double *x, const double *dx) {
    (void)user;                             /* detection looks at the whole path afterwards */
    (void)x;
    (void)dx;
    return 1;
}

/* Pulls and books of the touches at the minimiser x. */
static void clothi_touches_book(cloth_collide *c, const double *x) {
    cloth_ledger *l = &c->books;
    cloth_eval    e;
    double        work = 0;
    int           i;
    memset(&e, 0, sizeof e);
    e.x = x;
    (void)clothi_flat_eval(c, &e, &l->contact, &work);
    l->contact_work -= work;
    for (i = 0; i < c->ntouch; i++) {
        clothi_touch *q = c->touch + i;
        double        du[3], K[9], push;
        (void)clothi_touch_eval(c, q, x, q->pull, K);
        clothi_touch_motion(c, q, x, du);
        push = clothi_dot3(q->pull, q->normal) * clothi_dot3(du, q->normal);
        l->contact_work += clothi_dot3(q->pull, q->drift) - push;
        l->friction_loss += clothi_dot3(q->pull, du) - push;
        l->contact += clothi_touch_elastic(q, q->gap + clothi_dot3(du, q->normal));
    }
}

/* cloth_contact.balance: the touches' books, and what obstacles and pins gave through the rows. */
static void clothi_contact_balance(void *user, cloth_ledger *ledger) {
    const cloth_collide *c = (const cloth_collide *)user;
    int                  i, j, k;
    ledger->contact = c->books.contact;
    ledger->contact_work += c->books.contact_work;
    ledger->friction_loss += c->books.friction_loss;
    for (i = 0; i < c->nrow; i++)
        for (j = 0; j < c->row[i].n; j++)
            for (k = 0; k < 3 && c->row[i].multiplier > 0; k++) {
                const clothi_row *q = c->row + i;
                const int         at = 3 * q->v[j] + k;
                const double      gave = -q->multiplier / (c->h * c->h) * q->w[j] * q->normal[k] *
                                         (c->xb[at] - c->xa[at]);
                if (q->v[j] >= c->nv) ledger->contact_work += gave;
                else if (c->sim->pin[q->v[j]] >> k & 1) ledger->pin_work += gave;
                else continue;
                ledger->zone_loss += gave;
            }
}

/* Where a face crosses the obstacle at xb anew and that is not its way out, its vertices have gone
 * farther in: they pass with more care, or if they did so already not at all; 1: detection has to
 * look at them again. */
static int clothi_leaves_not(cloth_collide *c, cloth_status *status) {
    int i, k, found = 0;
    *status = clothi_bvh_cross_pairs(c->hooks, &c->tree, &c->solid, &c->meet);
    memset(c->moved, 0, (size_t)c->nv);
    for (i = 0; i < c->meet.count && !*status; i++) {
        const int f = c->meet.pair[2 * i], g = c->meet.pair[2 * i + 1];
        const int *v = c->faces + 3 * f, slot = c->slot[c->faces[3 * g]];
        int        in = 0;
        for (k = 0; k < 3; k++) in |= c->in[v[k]] == slot || c->in[v[k]] == CLOTHI_CAREFUL + slot;
        if (!in || !c->obstacle[slot].inside || c->off[g] ||
            !clothi_may_touch(c, -1, clothi_part_of(c, v[0]), slot, 0) ||
            !clothi_faces_intersect(c->xb, v, c->faces + 3 * g) ||
            clothi_couples_beside(c, c->now, c->nnow, f, g) || clothi_leaves_line(c, slot, f, g))
            continue;
        for (k = 0; k < 3; k++)
            if (c->in[v[k]] >= 0) c->moved[v[k]] = 1, found = 1;
    }
    for (i = 0; i < c->nin; i++) {
        int *in = c->in + c->queue[i];
        if (c->moved[c->queue[i]]) *in = *in < CLOTHI_CAREFUL ? *in + CLOTHI_CAREFUL : -2;
    }
    return found;
}

static cloth_status clothi_contact_resolve(void *user, const cloth_eval *e, double *x, double *v,
                                           int *active) {
    cloth_collide *c = (cloth_collide *)user;
    const size_t   bytes = 3 * (size_t)c->nv * sizeof(double);
    cloth_status   status = CLOTH_OK;
    double         start = clothi_now(c->hooks), then;
    int            i, hit = 0, first;
    (void)e;
    *active = 0;
    if (clothi_find_nonfinite(x, 3 * (size_t)c->nv) >= 0) return CLOTH_OK;  /* the core says so */
    memcpy(c->xb, x, bytes);
    memcpy(c->x_ie, x, bytes);
    memset(c->moved, 1, (size_t)c->nv);
    memset(c->frozen, 0, (size_t)c->nv);
    c->nrow = 0;
    c->calms = c->calm_pass = 0;
    c->report.passes = 0;
    clothi_touches_book(c, x);
    for (; !status; start = clothi_now(c->hooks)) {
        first = c->nrow;
        status = clothi_detect(c, &hit);
        then = clothi_now(c->hooks);
        c->report.ms_detect += 1e3 * (then - start);
        if (status || (hit == 0 && (c->nin == 0 || !clothi_leaves_not(c, &status)))) break;
        if (c->hooks->cancel.fn && c->hooks->cancel.fn(c->hooks->cancel.user))
            return CLOTH_ERR_CANCELLED;
        if (++c->report.passes > c->desc.max_passes + CLOTHI_RIGID_PASSES)
            return clothi_failed_pairs(c, first);
        if (hit) status = clothi_zones(c, first);
        c->report.ms_zones += 1e3 * (clothi_now(c->hooks) - then);
    }
    if (!status && v && c->nrow > 0) status = clothi_zone_speeds(c, v);
    if (status) return status;
    memcpy(x, c->xb, bytes);
    for (i = 0; i < c->nrow; i++) *active += c->row[i].multiplier > 0;
    for (i = 0; i < c->nv; i++) *active += c->frozen[i] != 0;
    c->report.rows = c->nrow;
    status = clothi_exempt_wander(c);
    if (!status) status = clothi_anchors_move(c, x);
    /* whom E_col pushes: BDF2 must not extrapolate */
    for (i = 0; i < c->ntouch && !status; i++) *active += c->touch[i].force > 0;
    return status;
}

static void clothi_contact_rollback(void *user, cloth_report *report) {
    cloth_collide *c = (cloth_collide *)user;
    c->begun = 0;
    c->ntouch = c->nrow = 0;                /* the queries know of no last step */
    if (report) report->failed_pairs = c->nfailed;
}

static void clothi_contact_commit(void *user, cloth_report *report) {
    cloth_collide *c = (cloth_collide *)user;
    clothi_anchor *swap = c->anchor;
    clothi_couple   *pair = c->exempt;
    double         least = c->desc.thickness;
    int            o, i, active = 0, cap = c->anchor_cap;
    for (o = 0; o < c->nobstacle; o++)
        if (c->obstacle[o].used)
            memcpy(clothi_pose(c->obstacle + o, 0), clothi_pose(c->obstacle + o, 1),
                   3 * (size_t)c->obstacle[o].nv * sizeof(double));
    c->anchor = c->next, c->nanchor = c->nnext, c->anchor_cap = c->next_cap;
    c->next = swap, c->nnext = 0, c->next_cap = cap;
    clothi_exempt_part(c);
    cap = c->exempt_cap;
    c->exempt = c->now, c->nexempt = c->nnow, c->exempt_cap = c->now_cap;
    c->now = pair, c->nnow = 0, c->now_cap = cap;
    c->seen = clothi_contact_seen(c);
    c->begun = 0;
    for (i = 0; i < c->ntouch; i++) {
        double u[3];
        clothi_touch_motion(c, c->touch + i, c->xb, u);
        active += -clothi_dot3(c->touch[i].pull, c->touch[i].normal) > 0;
        if (c->touch[i].out || c->touch[i].soft) continue;
        least = clothi_min(least, c->touch[i].gap + clothi_dot3(u, c->touch[i].normal));
    }
    for (i = 0; i < c->nrow; i++) {
        const clothi_row *q = c->row + i;
        if (!(q->multiplier > 0)) continue;
        active++;
        least = clothi_min(least, clothi_lone_gap(c, c->xb, q->kind, q->a, q->b));
    }
    c->report.exempt_pairs = c->nexempt;
    if (!report) return;
    report->contacts = active;
    report->exempt_pairs = c->nexempt;
    report->failed_pairs = 0;
    report->smallest_gap = least;
}

/* --- snapshot --- */

typedef struct clothi_contact_head {
    uint64_t seen, kind;
    int32_t  nanchor, nexempt, nobstacle, npose;
} clothi_contact_head;

/* What a snapshot does not hold and must find again: the obstacles' kinds and shapes, the desc. */
static uint64_t clothi_contact_kind(const cloth_collide *c) {
    const cloth_collide_desc *d = &c->desc;
    const double              number[7] = {d->thickness, c->stiffness, d->relaxation, d->friction,
                                           d->slip, d->max_push, d->push_out};
    uint64_t                  h = clothi_hash(0xcbf29ce484222325u, number, sizeof number);
    int                       o;
    for (o = 0; o < c->nobstacle; o++) {
        const clothi_obstacle *b = c->obstacle + o;
        const double           real[5] = {b->radius, b->friction, b->normal[0], b->normal[1],
                                          b->normal[2]};
        const uint32_t         whole[8] = {b->used ? 1u : 0u, b->generation, (uint32_t)b->kind,
                                           (uint32_t)b->nv, (uint32_t)b->nf, b->category, b->mask,
                                           b->inside ? 1u : 0u};
        if (!b->used) continue;
        h = clothi_hash(h, whole, sizeof whole);
        h = clothi_hash(h, real, sizeof real);
        h = clothi_hash(h, b->faces, 3 * (size_t)b->nf * sizeof(int));
    }
    return h;
}

static int clothi_contact_poses(const cloth_collide *c) {
    int o, n = 0;
    for (o = 0; o < c->nobstacle; o++) n += c->obstacle[o].used ? 6 * c->obstacle[o].nv : 0;
    return n;
}

static size_t clothi_contact_save_size(void *user) {
    const cloth_collide *c = (const cloth_collide *)user;
    return sizeof(clothi_contact_head) + (size_t)clothi_contact_poses(c) * sizeof(double) +
           (size_t)c->nanchor * sizeof(clothi_anchor) +
           ((size_t)c->nexempt + 1) / 2 * 2 * sizeof(clothi_couple);
}

static void clothi_contact_save(void *user, void *buf) {
    const cloth_collide *c = (const cloth_collide *)user;
    unsigned char       *out = (unsigned char *)buf;
    clothi_contact_head  head;
    int                  o;
    memset(&head, 0, sizeof head);
    memset(buf, 0, clothi_contact_save_size(user));
    head.seen = c->seen, head.kind = clothi_contact_kind(c);
    head.nanchor = c->nanchor, head.nexempt = c->nexempt;
    head.nobstacle = c->nobstacle, head.npose = clothi_contact_poses(c);
    memcpy(out, &head, sizeof head);
    out += sizeof head;
    for (o = 0; o < c->nobstacle; o++) {
        const size_t n = 6 * (size_t)c->obstacle[o].nv * sizeof(double);
        if (!c->obstacle[o].used) continue;
        memcpy(out, c->obstacle[o].x, n);
        out += n;
    }
    if (c->nanchor) memcpy(out, c->anchor, (size_t)c->nanchor * sizeof *c->anchor);
    out += (size_t)c->nanchor * sizeof *c->anchor;
    if (c->nexempt) memcpy(out, c->exempt, (size_t)c->nexempt * sizeof *c->exempt);
}

/* A snapshot of these obstacles, whole; then there is room for it. */
static cloth_status clothi_contact_unsaved(void *user, const void *buf, size_t size) {
    cloth_collide      *c = (cloth_collide *)user;
    clothi_contact_head head;
    const size_t        poses = (size_t)clothi_contact_poses(c) * sizeof(double);
    cloth_status        status = CLOTH_OK;
    memset(&head, 0, sizeof head);
    if (size >= sizeof head) memcpy(&head, buf, sizeof head);
    if (size < sizeof head || head.nobstacle != c->nobstacle ||
        head.npose != clothi_contact_poses(c) || head.nanchor < 0 || head.nexempt < 0 ||
        head.kind != clothi_contact_kind(c) ||
        size != sizeof head + poses + (size_t)head.nanchor * sizeof(clothi_anchor) +
                    ((size_t)head.nexempt + 1) / 2 * 2 * sizeof(clothi_couple))
        return clothi_fail(c->hooks, CLOTH_ERR_FORMAT,
                           "cloth_sim_restore: the snapshot has other obstacles, or another "
                           "cloth_collide_desc, than this sim");
    while (!status && c->anchor_cap < head.nanchor)
        status = clothi_grow(c->hooks, (void **)&c->anchor, c->anchor_cap, &c->anchor_cap,
                             sizeof *c->anchor);
    while (!status && c->exempt_cap < head.nexempt)
        status = clothi_grow(c->hooks, (void **)&c->exempt, c->exempt_cap, &c->exempt_cap,
                             sizeof *c->exempt);
    return status;
}

/* Bytes of all that a collide owns; frees it too, but for *c itself. */
static size_t clothi_contact_blocks(cloth_collide *c, int release) {
    void *const block[] = {
        c->faces, c->edges, c->slot, c->area, c->xa, c->xb, c->box_v, c->box_f, c->off, c->off_v,
        c->off_e, c->features.edges, c->tree.node, c->solid.node, c->meet.pair, c->meet.start,
        c->vf.pair, c->vf.start, c->ee.pair, c->ee.start, c->zone_start, c->zone_cursor,
        c->zone_order, c->qp_row, c->qp_col, c->qp_val, c->qp_h, c->qp_lambda, c->qp_guess,
        c->qp_norm, c->qp_minv, c->qp_x0, c->qp_x, c->part, c->vertex_part, c->x_ie, c->moved,
        c->frozen, c->near_f, c->in, c->queue, c->zone_of, c->zone_number, c->local, c->member,
        c->touch, c->row, c->pair, c->struck, c->anchor, c->next, c->exempt, c->now, c->failed,
        c->obstacle};
    size_t sum = clothi_block_size(c) + cloth_qp_work_bytes(c->qp_options.work);
    size_t i;
    int    o;
    for (o = 0; o < c->nobstacle; o++) {
        clothi_obstacle *b = c->obstacle + o;
        sum += clothi_block_size(b->x) + clothi_block_size(b->faces) +
               clothi_inside_bytes(b->inside);
        if (release) clothi_obstacle_free(c->hooks, b);
    }
    for (i = 0; i < sizeof block / sizeof *block; i++) {
        sum += clothi_block_size(block[i]);
        if (release) clothi_free(c->hooks, block[i]);
    }
    if (release) cloth_qp_work_destroy(c->qp_options.work);
    return sum;
}

/* The queries know of no last step. */
static void clothi_contact_forget(cloth_collide *c) {
    c->begun = 0;
    c->ntouch = c->nrow = c->nfailed = 0;
    memset(&c->report, 0, sizeof c->report);
}

static void clothi_contact_load(void *user, const void *buf) {
    cloth_collide       *c = (cloth_collide *)user;
    const unsigned char *in = (const unsigned char *)buf;
    clothi_contact_head  head;
    int                  o;
    memcpy(&head, in, sizeof head);
    in += sizeof head;
    clothi_contact_forget(c);
    for (o = 0; o < c->nobstacle; o++) {
        const size_t n = 6 * (size_t)c->obstacle[o].nv * sizeof(double);
        if (!c->obstacle[o].used) continue;
        memcpy(c->obstacle[o].x, in, n);
        in += n;
    }
    c->nanchor = head.nanchor, c->nexempt = head.nexempt;
    if (c->nanchor) memcpy(c->anchor, in, (size_t)c->nanchor * sizeof *c->anchor);
    in += (size_t)c->nanchor * sizeof *c->anchor;
    if (c->nexempt) memcpy(c->exempt, in, (size_t)c->nexempt * sizeof *c->exempt);
    c->report.exempt_pairs = c->nexempt;
    c->seen = head.seen;
}

/* Obstacles go back to where they were added. */
static void clothi_contact_reset(void *user) {
    cloth_collide *c = (cloth_collide *)user;
    int            o;
    clothi_contact_forget(c);
    c->nanchor = c->nexempt = 0;
    c->seen = 0;
    for (o = 0; o < c->nobstacle; o++) {
        const size_t bytes = 3 * (size_t)c->obstacle[o].nv * sizeof(double);
        if (!c->obstacle[o].used) continue;
        memcpy(clothi_pose(c->obstacle + o, 0), clothi_pose(c->obstacle + o, 2), bytes);
        memcpy(clothi_pose(c->obstacle + o, 1), clothi_pose(c->obstacle + o, 2), bytes);
    }
}

static size_t clothi_contact_bytes(void *user) {
    return clothi_contact_blocks((cloth_collide *)user, 0);
}

/* --- create --- */

static cloth_status clothi_desc_number(const cloth_hooks *hooks, const char *name, double a,
                                       int above) {
    if (clothi_finite(a) && (above ? a > 0 : a >= 0)) return CLOTH_OK;
    return clothi_fail(hooks, clothi_finite(a) ? CLOTH_ERR_ARGUMENT : CLOTH_ERR_NONFINITE,
                       "%s = %g must be finite and %s 0", name, a, above ? ">" : ">=");
}

/* x [n x 3]: finite, and no farther out than that areas' squares have room. */
static cloth_status clothi_check_places(const cloth_hooks *hooks, const char *call,
                                        const char *name, const double *x, int n) {
    size_t i, size = 3 * (size_t)n;
    for (i = 0; i < size && fabs(x[i]) <= CLOTHI_FARTHEST; i++) continue;
    if (i == size) return CLOTH_OK;
    if (!clothi_finite(x[i]))
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "%s%s[%i] = %g", call, name, (int)i, x[i]);
    return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s%s[%i] = %g is over %g", call, name, (int)i,
                       x[i], CLOTHI_FARTHEST);
}

static cloth_status clothi_collide_check(const cloth_sim *sim, const cloth_collide_desc *d) {
    const cloth_hooks *hooks = &sim->hooks;
    cloth_status       status;
    double             big = 0;
    int                i;
    if (d->cookie != CLOTHI_COLLIDE_COOKIE) return CLOTH_ERR_UNINIT;
    status = clothi_desc_number(hooks, "collide.thickness", d->thickness, 1);
    if (!status) status = clothi_desc_number(hooks, "collide.stiffness", d->stiffness, 0);
    if (!status) status = clothi_desc_number(hooks, "collide.relaxation", d->relaxation, 0);
    if (!status) status = clothi_desc_number(hooks, "collide.friction", d->friction, 0);
    if (!status) status = clothi_desc_number(hooks, "collide.slip", d->slip, 1);
    if (!status) status = clothi_desc_number(hooks, "collide.max_push", d->max_push, 1);
    if (!status) status = clothi_desc_number(hooks, "collide.push_out", d->push_out, 0);
    if (status) return status;
    if (d->max_passes < 1 || d->max_passes > CLOTHI_MOST_PASSES)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "collide.max_passes = %i is not in 1 .. %i",
                           d->max_passes, CLOTHI_MOST_PASSES);
    for (i = 0; i < 3 * sim->model->nv; i++)
        big = clothi_max(big, fabs(sim->state.x[i]));
    if (d->thickness < CLOTHI_FINEST * big)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "collide.thickness = %g is lost in the rounding of x = %g",
                           d->thickness, big);
    if (d->initial != CLOTH_INITIAL_REFUSE && d->initial != CLOTH_INITIAL_EXEMPT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "collide.initial = %i is no CLOTH_INITIAL_",
                           (int)d->initial);
    if (d->nparts != 0 && (d->nparts != sim->model->nparts || !d->parts))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "collide.nparts = %i, the model has %i%s",
                           d->nparts, sim->model->nparts, d->parts ? "" : "; parts is NULL");
    if (sim->model->desc.contact == CLOTH_CONTACT_NONE)
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED,
                           "cloth_collide_create: the model's desc.contact is CLOTH_CONTACT_NONE");
    if (sim->model->tie)
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED,
                           "cloth_collide_create: a model with ties has no contact");
    if (sim->contact_on)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_collide_create: the sim has a contact already");
    return CLOTH_OK;
}

static cloth_status clothi_collide_arrays(cloth_collide *c) {
    const cloth_hooks *k = c->hooks;
    const size_t       nv = (size_t)c->nv;
    c->vertex_part = (int *)clothi_alloc(k, nv, sizeof(int));
    c->x_ie = (double *)clothi_alloc(k, 3 * nv, sizeof(double));
    c->moved = (unsigned char *)clothi_alloc(k, nv, 1);
    c->frozen = (unsigned char *)clothi_alloc(k, nv, 1);
    c->near_f = (int *)clothi_alloc(k, (size_t)c->nf, sizeof(int));
    c->in = (int *)clothi_alloc(k, nv, sizeof(int));
    c->queue = (int *)clothi_alloc(k, nv, sizeof(int));
    c->zone_of = (int *)clothi_alloc(k, nv, sizeof(int));
    c->zone_number = (int *)clothi_alloc(k, nv, sizeof(int));
    c->local = (int *)clothi_alloc(k, nv, sizeof(int));
    c->member = (int *)clothi_alloc(k, nv, sizeof(int));
    c->qp_minv = (double *)clothi_alloc(k, 3 * nv, sizeof(double));
    c->qp_x0 = (double *)clothi_alloc(k, 3 * nv, sizeof(double));
    c->qp_x = (double *)clothi_alloc(k, 3 * nv, sizeof(double));
    if (c->desc.nparts)
        c->part = (cloth_collide_part *)clothi_alloc(k, (size_t)c->desc.nparts, sizeof *c->part);
    return c->vertex_part && c->x_ie && c->moved && c->frozen && c->near_f && c->in && c->queue &&
                   c->zone_of &&
                   c->zone_number && c->local && c->member && c->qp_minv && c->qp_x0 && c->qp_x &&
                   (c->part || !c->desc.nparts)
               ? CLOTH_OK
               : CLOTH_ERR_MEMORY;
}

/* Pa/m: a sheet under 30 times its weight rests where the force is k t/4, at t/2. */
static double clothi_collide_stiffness(const cloth_sim *s, double thickness) {
    double mass = 0, area = 0;
    int    i;
    for (i = 0; i < s->model->nv; i++) mass += s->params.mass[i];
    for (i = 0; i < s->model->nf; i++) area += clothi_rest_area(s->params.X, i);
    return 30 * 9.81 * mass / area / (0.25 * thickness);
}

static void clothi_collide_connect(cloth_collide *c) {
    cloth_contact k;
    memset(&k, 0, sizeof k);
    k.user = c;
    k.begin = clothi_contact_begin;
    k.update = clothi_contact_update;
    k.eval = clothi_contact_eval;
    k.max_step = clothi_contact_max_step;
    k.resolve = clothi_contact_resolve;
    k.commit = clothi_contact_commit;
    k.rollback = clothi_contact_rollback;
    k.reset = clothi_contact_reset;
    k.save_size = clothi_contact_save_size;
    k.save = clothi_contact_save;
    k.load = clothi_contact_load;
    k.bytes = clothi_contact_bytes;
    k.check = clothi_contact_unsaved;
    k.balance = clothi_contact_balance;
    (void)cloth_sim_set_contact(c->sim, &k);
}

/* Outside a step: what a host wrote into x is a number. */
static cloth_status clothi_look_check(const cloth_collide *c) {
    return clothi_check_places(c->hooks, "the state", "'s x", c->sim->state.x, c->nv);
}

/* Checks where everything is now, outside a step: what it finds becomes state. */
static cloth_status clothi_collide_look(cloth_collide *c) {
    cloth_status status = clothi_look_check(c);
    clothi_couple *swap = c->exempt;
    int          cap = c->exempt_cap;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    if (!status) status = clothi_inside_faces(c);
    if (!status) status = clothi_contact_check(c);
    if (status) return status == CLOTH_ERR_STEP ? CLOTH_ERR_MESH : status;
    c->exempt = c->now, c->nexempt = c->nnow, c->exempt_cap = c->now_cap;
    c->now = swap, c->nnow = 0, c->now_cap = cap;
    c->report.exempt_pairs = c->nexempt;
    if (c->seen != clothi_contact_seen(c)) c->nanchor = 0;  /* a host wrote x meanwhile */
    c->seen = clothi_contact_seen(c);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_create(cloth_sim *sim, const cloth_collide_desc *desc,
                                            cloth_collide **out) {
    cloth_collide_desc d;
    cloth_collide     *c;
    cloth_status       status;
    int                i;
    if (!out) return CLOTH_ERR_ARGUMENT;
    *out = NULL;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    d = desc ? *desc : cloth_collide_desc_default();
    status = clothi_collide_check(sim, &d);
    if (status) return status;
    c = (cloth_collide *)clothi_alloc(&sim->hooks, 1, sizeof *c);
    if (!c) return clothi_fail(&sim->hooks, CLOTH_ERR_MEMORY, "no memory for the contact");
    c->sim = sim;
    c->hooks = &sim->hooks;
    c->desc = d;
    c->desc.parts = NULL;
    c->self = sim->model->desc.contact == CLOTH_CONTACT_SELF;
    c->nv = sim->model->nv, c->nf = sim->model->nf;
    c->stiffness = d.stiffness > 0 ? d.stiffness : clothi_collide_stiffness(sim, d.thickness);
    c->qp_options = cloth_qp_options_default();
    c->qp_options.hooks.allocator = sim->hooks.allocator;
    c->qp_options.hooks.cancel = sim->hooks.cancel;
    status = clothi_collide_arrays(c);
    if (!status) {
        if (d.nparts) memcpy(c->part, d.parts, (size_t)d.nparts * sizeof *d.parts);
        for (i = 0; i < c->nv; i++) c->local[i] = -1;
        for (i = 0; i < 3 * c->nf; i++)
            c->vertex_part[sim->model->faces[i]] = sim->model->part[i / 3];
        status = clothi_world_build(c);
    }
    if (!status) status = cloth_qp_work_create(c->hooks, &c->qp_options.work);
    if (!status) status = clothi_collide_look(c);
    if (status) {
        cloth_collide_destroy(c);
        return status;
    }
    clothi_collide_connect(c);
    *out = c;
    return CLOTH_OK;
}

CLOTH_API void cloth_collide_destroy(cloth_collide *c) {
    if (!c) return;
    if (c->sim->contact_on && c->sim->contact.user == c) (void)cloth_sim_set_contact(c->sim, NULL);
    (void)clothi_contact_blocks(c, 1);
    clothi_free(c->hooks, c);
}

/* --- obstacles: add, remove, move --- */

/* Obstacles have come or gone: a new world, looked at. What was found at the last step names the
 * old one and goes with it. On failure the old world stays; the caller then puts its obstacles back
 * and counts [clothi_world_count]. */
static cloth_status clothi_world_change(cloth_collide *c) {
    cloth_collide old = *c;
    cloth_status  status;
    clothi_world_take(c, NULL);
    status = clothi_world_build(c);
    if (!status) status = clothi_collide_look(c);
    if (status) {
        clothi_world_free(c);
        clothi_world_take(c, &old);
        return status;
    }
    clothi_world_free(&old);
    c->ntouch = c->nrow = c->nfailed = 0;
    return CLOTH_OK;
}

/* Numbers of vertices and faces that a desc of its kind has; 0 vertices: no such kind. */
static int clothi_obstacle_shape(const cloth_obstacle_desc *d, int *nf) {
    *nf = d->kind == CLOTH_OBSTACLE_MESH ? d->nf : d->kind == CLOTH_OBSTACLE_BOX ? 12 : 0;
    switch (d->kind) {
    case CLOTH_OBSTACLE_MESH: return d->nv;
    case CLOTH_OBSTACLE_SPHERE: return 1;
    case CLOTH_OBSTACLE_CAPSULE: return 2;
    case CLOTH_OBSTACLE_PLANE: return 1;
    case CLOTH_OBSTACLE_BOX: return 8;
    case CLOTH_OBSTACLE_GRID: return 1;
    case CLOTH_OBSTACLE_FORCE_INT: break;
    }
    return 0;
}

static cloth_status clothi_obstacle_check(const cloth_hooks *hooks, const cloth_obstacle_desc *d) {
    cloth_status status;
    int          nf, nv;
    if (d->cookie != CLOTHI_OBSTACLE_COOKIE) return CLOTH_ERR_UNINIT;
    if (d->kind < CLOTH_OBSTACLE_MESH || d->kind > CLOTH_OBSTACLE_GRID)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "obstacle.kind = %i is no CLOTH_OBSTACLE_",
                           (int)d->kind);
    nv = clothi_obstacle_shape(d, &nf);
    if (!d->x || nv < 1 || nv > CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "obstacle.nv = %i, x %s", nv,
                           d->x ? "given" : "NULL");
    status = clothi_check_places(hooks, "obstacle", ".x", d->x, nv);
    if (!status) status = clothi_desc_number(hooks, "obstacle.friction", d->friction, 0);
    if (!status && (d->kind == CLOTH_OBSTACLE_SPHERE || d->kind == CLOTH_OBSTACLE_CAPSULE))
        status = clothi_desc_number(hooks, "obstacle.radius", d->radius, 1);
    if (status) return status;
    if (clothi_finite(d->radius) && d->radius > CLOTHI_FARTHEST)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "obstacle.radius = %g is over %g", d->radius,
                           CLOTHI_FARTHEST);
    if (d->kind == CLOTH_OBSTACLE_PLANE &&
        (clothi_find_nonfinite(d->normal, 3) >= 0 || !(clothi_max_abs(d->normal, 3) > 0)))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "obstacle.normal = (%g, %g, %g)",
                           d->normal[0], d->normal[1], d->normal[2]);
    if (d->kind != CLOTH_OBSTACLE_MESH) return CLOTH_OK;
    if (!d->faces || nf < 1 || nf > CLOTH_MAX_COUNT)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "obstacle.nf = %i, faces %s", nf,
                           d->faces ? "given" : "NULL");
    return clothi_check_faces(hooks, nv, nf, d->faces);
}

static cloth_status clothi_obstacle_check_grid(const cloth_collide *c,
                                               const cloth_obstacle_desc *d) {
    const cloth_grid *g = d->grid;
    cloth_status      status = clothi_desc_number(c->hooks, "obstacle.radius", d->radius, 0);
    ptrdiff_t         at;
    int               k;
    if (status) return status;
    if (!g || !g->phi)
        return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "obstacle.grid%s is NULL",
                           g ? "->phi" : "");
    for (k = 0; k < 3; k++)
        if (g->n[k] < 2)
            return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "obstacle.grid->n[%i] = %i is below 2",
                               k, g->n[k]);
    status = clothi_desc_number(c->hooks, "obstacle.grid->cell", g->cell, 1);
    if (!status) status = clothi_desc_number(c->hooks, "obstacle.grid->band", g->band, 1);
    if (status) return status;
    at = clothi_find_nonfinite(g->origin, 3);
    if (at >= 0)
        return clothi_fail(c->hooks, CLOTH_ERR_NONFINITE, "obstacle.grid->origin[%i] = %g", (int)at,
                           g->origin[at]);
    at = clothi_find_nonfinite(g->phi, (size_t)g->n[0] * (size_t)g->n[1] * (size_t)g->n[2]);
    if (at >= 0)
        return clothi_fail(c->hooks, CLOTH_ERR_NONFINITE, "obstacle.grid->phi[%i] = %g", (int)at,
                           g->phi[at]);
    if (!(g->band > d->radius + c->desc.thickness))
        return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "obstacle.grid->band = %g must be over "
                           "radius %g + thickness %g", g->band, d->radius, c->desc.thickness);
    if (c->sim->model->desc.integrator != CLOTH_INTEGRATOR_LEAPFROG) return CLOTH_OK;
    return clothi_fail(c->hooks, CLOTH_ERR_UNSUPPORTED, "obstacle.kind = %i: leapfrog has no "
                       "proximity potential, which is all that a grid has", (int)d->kind);
}

static cloth_status clothi_obstacle_fill(cloth_collide *c, clothi_obstacle *o,
                                         const cloth_obstacle_desc *d) {
    double       normal[3], big = clothi_max_abs(d->normal, 3), size;
    cloth_status status;
    int          k;
    for (k = 0; k < 3; k++) normal[k] = big > 0 ? d->normal[k] / big : 0;
    size = sqrt(clothi_dot3(normal, normal));
    o->kind = d->kind;
    o->nv = clothi_obstacle_shape(d, &o->nf);
    o->x = (double *)clothi_alloc(c->hooks, 9 * (size_t)o->nv, sizeof(double));
    o->faces = (int *)clothi_alloc(c->hooks, 3 * (size_t)o->nf, sizeof(int));
    if (!o->x || !o->faces) return CLOTH_ERR_MEMORY;
    for (k = 0; k < 3; k++) {
        memcpy(clothi_pose(o, k), d->x, 3 * (size_t)o->nv * sizeof(double));
        o->normal[k] = d->kind == CLOTH_OBSTACLE_PLANE ? normal[k] / size : 0;
    }
    if (o->nf)
        memcpy(o->faces, d->kind == CLOTH_OBSTACLE_BOX ? clothi_box_faces : d->faces,
               3 * (size_t)o->nf * sizeof(int));
    o->grid = d->kind == CLOTH_OBSTACLE_GRID ? d->grid : NULL;
    o->radius = d->kind == CLOTH_OBSTACLE_SPHERE || d->kind == CLOTH_OBSTACLE_CAPSULE || o->grid
                    ? d->radius : 0;
    o->friction = d->friction;
    o->category = d->category, o->mask = d->mask;
    o->used = 1;
    o->generation = (o->generation + 1) & 0xffffu;
    if (d->kind != CLOTH_OBSTACLE_MESH || !d->self_penetrating) return CLOTH_OK;
    status = clothi_inside_create(c->hooks, o->nv, o->nf, o->faces, &o->inside);
    if (!status) o->inside->room = CLOTHI_ROOM * c->desc.thickness;
    if (!status && c->desc.push_out > 0) status = clothi_inside_ranks(o->inside);
    return status;
}

CLOTH_API cloth_status cloth_collide_add(cloth_collide *c, const cloth_obstacle_desc *desc,
                                         cloth_obstacle *id) {
    clothi_obstacle *o;
    cloth_status     status;
    int              slot = 0, known;
    if (id) id->id = 0;
    if (!c) return CLOTH_ERR_ARGUMENT;
    if (!desc) return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "cloth_collide_add: desc is NULL");
    known = c->nobstacle;
    status = clothi_obstacle_check(c->hooks, desc);
    if (!status && desc->kind == CLOTH_OBSTACLE_GRID) status = clothi_obstacle_check_grid(c, desc);
    if (status) return status;
    while (slot < c->nobstacle && c->obstacle[slot].used) slot++;
    if (slot >= 0xffff)
        return clothi_fail(c->hooks, CLOTH_ERR_CAPACITY, "more than %i obstacles", 0xffff);
    status = clothi_grow(c->hooks, (void **)&c->obstacle, slot, &c->obstacle_cap, sizeof *o);
    if (status) return status;
    if (slot == c->nobstacle) c->nobstacle++;
    o = c->obstacle + slot;
    status = clothi_obstacle_fill(c, o, desc);
    if (!status) status = clothi_world_change(c);
    if (status) {                           /* as before */
        clothi_obstacle_free(c->hooks, o);
        c->nobstacle = known;
        (void)clothi_world_count(c);
        return status;
    }
    if (id) *id = clothi_obstacle_id(c, slot);
    return CLOTH_OK;
}

static cloth_status clothi_obstacle_gone(const cloth_collide *c, cloth_obstacle id,
                                         const char *call) {
    if (!c) return CLOTH_ERR_HANDLE;
    return clothi_fail(c->hooks, CLOTH_ERR_HANDLE, "%s: obstacle %i is not there, or no more", call,
                       (int)(id.id & 0xffffu));
}

/* What friction remembers of one obstacle; keys name features of the cloth, whose numbers stay. */
static void clothi_anchors_drop(cloth_collide *c, int slot) {
    int i, n = 0;
    for (i = 0; i < c->nanchor; i++)
        if (c->anchor[i].key.cloth || c->anchor[i].key.b != slot) c->anchor[n++] = c->anchor[i];
    c->nanchor = n;
}

CLOTH_API cloth_status cloth_collide_remove(cloth_collide *c, cloth_obstacle id) {
    clothi_obstacle *o = clothi_obstacle_of(c, id);
    cloth_status     status;
    if (!o) return clothi_obstacle_gone(c, id, "cloth_collide_remove");
    o->used = 0;
    status = clothi_world_change(c);
    if (status) {                           /* as before */
        o->used = 1;
        (void)clothi_world_count(c);
        return status;
    }
    clothi_obstacle_free(c->hooks, o);
    clothi_anchors_drop(c, (int)(o - c->obstacle));
    return CLOTH_OK;
}

static cloth_status clothi_pose_check(const cloth_collide *c, cloth_obstacle id, const char *call,
                                      const double *x) {
    const clothi_obstacle *o = clothi_obstacle_of(c, id);
    if (!o) return clothi_obstacle_gone(c, id, call);
    if (!x) return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "%s: x is NULL", call);
    return clothi_check_places(c->hooks, call, ": x", x, o->nv);
}

CLOTH_API cloth_status cloth_collide_move(cloth_collide *c, cloth_obstacle id,
                                          const double *x_end) {
    clothi_obstacle *o = clothi_obstacle_of(c, id);
    cloth_status     status = clothi_pose_check(c, id, "cloth_collide_move", x_end);
    if (!status) memcpy(clothi_pose(o, 1), x_end, 3 * (size_t)o->nv * sizeof(double));
    return status;
}

CLOTH_API cloth_status cloth_collide_teleport(cloth_collide *c, cloth_obstacle id,
                                              const double *x) {
    clothi_obstacle *o = clothi_obstacle_of(c, id);
    cloth_status     status = clothi_pose_check(c, id, "cloth_collide_teleport", x);
    double          *spare, *pose;
    size_t           bytes;
    if (status) return status;
    bytes = 3 * (size_t)o->nv * sizeof(double);
    pose = clothi_pose(o, 0);
    spare = (double *)clothi_alloc(c->hooks, 6 * (size_t)o->nv, sizeof(double));
    if (!spare) return CLOTH_ERR_MEMORY;
    memcpy(spare, pose, 2 * bytes);
    memcpy(pose, x, bytes);
    memcpy(clothi_pose(o, 1), x, bytes);
    status = clothi_collide_look(c);
    if (status)
        memcpy(pose, spare, 2 * bytes);
    else
        clothi_anchors_drop(c, (int)(o - c->obstacle));
    clothi_free(c->hooks, spare);
    return status;
}

/* --- a step that may be shorter --- */

/* Pins, attachments and obstacles: targets at `part` of their way; back again at part 1. */
static void clothi_shorten(cloth_collide *c, const double *targets, double part) {
    cloth_sim *s = c->sim;
    int        o, i, k;
    for (i = 0; i < 3 * c->nv; i++, targets++)
        s->target[i] = part < 1 ? s->state.x[i] + part * (*targets - s->state.x[i]) : *targets;
    for (i = 0; i < s->model->desc.max_attachments; i++)
        for (k = 0; k < 3; k++, targets++) {
            clothi_attach *q = s->attach + i;
            q->target[k] = part < 1 ? q->pose[k] + part * (*targets - q->pose[k]) : *targets;
        }
    for (o = 0; o < c->nobstacle; o++)
        for (i = 0; c->obstacle[o].used && i < 3 * c->obstacle[o].nv; i++, targets++) {
            double pose = clothi_pose(c->obstacle + o, 0)[i];
            clothi_pose(c->obstacle + o, 1)[i] = part < 1 ? pose + part * (*targets - pose)
                                                          : *targets;
        }
}

static size_t clothi_targets(const cloth_collide *c, double *out) {
    const cloth_sim *s = c->sim;
    size_t           n = 0;
    int              o, i, k;
    for (i = 0; i < 3 * c->nv; i++, n++)
        if (out) out[n] = s->target[i];
    for (i = 0; i < s->model->desc.max_attachments; i++)
        for (k = 0; k < 3; k++, n++)
            if (out) out[n] = s->attach[i].target[k];
    for (o = 0; o < c->nobstacle; o++)
        for (i = 0; c->obstacle[o].used && i < 3 * c->obstacle[o].nv; i++, n++)
            if (out) out[n] = clothi_pose(c->obstacle + o, 1)[i];
    return n;
}

/* Failed in a way that a shorter step may not. */
static int clothi_shortens(const cloth_report *r) {
    return r->outcome == CLOTH_STEP_COLLISION_FAILED || r->outcome == CLOTH_STEP_STALLED;
}

CLOTH_API cloth_status cloth_collide_step(cloth_collide *c, double h, int halvings,
                                          cloth_report *report) {
    cloth_report local, *r = report ? report : &local;
    cloth_status status;
    double      *targets, part = 1;
    int          k;
    if (!c) return CLOTH_ERR_ARGUMENT;
    if (halvings < 0 || halvings > 30)
        return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_collide_step: halvings = %i is not in 0 .. 30", halvings);
    status = cloth_step(c->sim, h, r);
    if (!clothi_shortens(r) || halvings == 0) return status;
    targets = (double *)clothi_alloc(c->hooks, clothi_targets(c, NULL), sizeof(double));
    if (!targets) return r->status;         /* as the whole step said */
    (void)clothi_targets(c, targets);
    for (k = 0; k < halvings && clothi_shortens(r); k++) {
        part *= 0.5;
        clothi_shorten(c, targets, part);
        status = cloth_step(c->sim, h * part, r);
    }
    clothi_shorten(c, targets, 1);
    if (!status) c->report.fraction = part;
    clothi_free(c->hooks, targets);
    return status;
}

/* ===== [8.5] QUERIES ========================================================================= */

CLOTH_API cloth_collide_report cloth_collide_last(const cloth_collide *c) {
    cloth_collide_report none;
    memset(&none, 0, sizeof none);
    return c ? c->report : none;
}

static void clothi_touch_public(const cloth_collide *c, int kind, int a, int b, const int *v,
                                const double *w, int n, const double *normal, cloth_touch *out) {
    int i;
    memset(out, 0, sizeof *out);
    out->edge_edge = kind == CLOTHI_EE;
    out->obstacle = clothi_obstacle_id(c, clothi_pair_slot(c, kind, a, b));
    for (i = 0; i < n; i++)
        if (v[i] < c->nv) {
            out->vertex[out->n] = v[i];
            out->weight[out->n++] = w[i];
        }
    memcpy(out->normal, normal, sizeof out->normal);
}

/* An output with room for `max` entries, which is given or not. */
static cloth_status clothi_query_check(const cloth_collide *c, const char *call, int max,
                                       int given) {
    if (!c) return CLOTH_ERR_ARGUMENT;
    if (max < 0) return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "%s: max = %i", call, max);
    if (max == 0 || given) return CLOTH_OK;
    return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "%s: its output is NULL", call);
}

/* Touches with a force, then rows with a multiplier. */
CLOTH_API cloth_status cloth_collide_touches(const cloth_collide *c, int max, cloth_touch *touch,
                                             int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_touches", max, touch != NULL);
    int          i, j = 0, n = 0;
    if (status) return status;
    for (i = 0; i < c->ntouch; i++) {       /* sorted like the anchors */
        const clothi_touch *q = c->touch + i;
        const double        force = -clothi_dot3(q->pull, q->normal);
        if (!(force > 0)) continue;
        while (j < c->nanchor && clothi_key_compare(&c->anchor[j].key, &q->key) < 0) j++;
        if (n < max) {
            clothi_touch_public(c, q->kind, q->a, q->b, q->v, q->w, q->n, q->normal, touch + n);
            touch[n].gap = q->gap;
            touch[n].force = force;
            touch[n].sliding = j < c->nanchor &&
                               clothi_key_compare(&c->anchor[j].key, &q->key) == 0 &&
                               c->anchor[j].sliding > 0;
        }
        n++;
    }
    for (i = 0; i < c->nrow; i++) {
        const clothi_row *q = c->row + i;
        if (!(q->multiplier > 0)) continue;
        if (n < max) {
            clothi_touch_public(c, q->kind, q->a, q->b, q->v, q->w, q->n, q->normal, touch + n);
            touch[n].gap = q->gap;
            touch[n].force = q->multiplier / (c->h * c->h);
            touch[n].impulse = q->multiplier / c->h;
        }
        n++;
    }
    if (count) *count = n;
    return CLOTH_OK;
}

/* E_col's part of the forces, or friction alone. */
static void clothi_touch_forces(const cloth_collide *c, int friction, double *f) {
    cloth_eval e;
    double     unused = 0;
    int        i, j, k;
    memset(f, 0, 3 * (size_t)c->nv * sizeof(double));
    memset(&e, 0, sizeof e);
    e.x = c->x_ie, e.grad = f;
    if (!friction) (void)clothi_flat_eval(c, &e, &unused, NULL);
    for (i = 0; i < 3 * c->nv; i++) f[i] = 0 - f[i];
    for (i = 0; i < c->ntouch; i++) {
        const clothi_touch *q = c->touch + i;
        const double        push = friction ? clothi_dot3(q->pull, q->normal) : 0;
        for (j = 0; j < q->n; j++)
            for (k = 0; q->v[j] < c->nv && k < 3; k++)
                f[3 * q->v[j] + k] -= q->w[j] * (q->pull[k] - push * q->normal[k]);
    }
}

CLOTH_API cloth_status cloth_collide_friction(const cloth_collide *c, double *f) {
    cloth_status status = clothi_query_check(c, "cloth_collide_friction", 1, f != NULL);
    if (!status) clothi_touch_forces(c, 1, f);
    return status;
}

CLOTH_API cloth_status cloth_collide_forces(const cloth_collide *c, double *f) {
    cloth_status status = clothi_query_check(c, "cloth_collide_forces", 1, f != NULL);
    int          i, j, k;
    if (status) return status;
    clothi_touch_forces(c, 0, f);
    for (i = 0; i < c->nrow; i++)
        for (j = 0; j < c->row[i].n; j++)
            for (k = 0; c->row[i].v[j] < c->nv && k < 3; k++)
                f[3 * c->row[i].v[j] + k] += c->row[i].multiplier / (c->h * c->h) *
                                             c->row[i].w[j] * c->row[i].normal[k];
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_gap(cloth_collide *c, double range, double *gap) {
    cloth_status status;
    int          i, o, asked;
    status = clothi_query_check(c, "cloth_collide_gap", 1, gap != NULL);
    if (!status) status = clothi_desc_number(c->hooks, "cloth_collide_gap: range", range, 1);
    if (!status) status = clothi_look_check(c);
    if (status) return status;
    *gap = range;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    c->solid_known = 0;
    asked = c->report.exempt_faces;         /* the report is the step's */
    c->ask = range;
    status = clothi_inside_again(c);
    c->ask = 0;
    c->report.exempt_faces = asked;
    if (!status) status = clothi_candidates(c, 0, range);
    c->solid_known = 0;
    for (i = 0; i < c->npair && !status; i++)
        *gap = clothi_min(*gap, clothi_lone_gap(c, c->xa, c->pair[i].kind, c->pair[i].a,
                                                c->pair[i].b));
    for (o = 0; o < c->nobstacle && !status; o++)
        for (i = 0; c->obstacle[o].used && clothi_is_wall(c->obstacle + o) && i < c->nv; i++)
            if (clothi_may_touch(c, -1, c->vertex_part[i], o, 0))
                *gap = clothi_min(*gap, clothi_lone_gap(c, c->xa, CLOTHI_VP, i, o));
    return status;
}

CLOTH_API cloth_status cloth_collide_intersections(cloth_collide *c, int max, int *pairs,
                                                   int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_intersections", max, pairs != NULL);
    int          i, n = 0;
    if (!status) status = clothi_look_check(c);
    if (status) return status;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    c->nnow = 0;
    status = clothi_crossings(c, 0);
    c->solid_known = 0;
    for (i = 0; i < c->nnow && !status; i++) {
        if (c->now[i].kind >= 0) continue;
        if (n < max) pairs[2 * n] = c->now[i].a, pairs[2 * n + 1] = c->now[i].b;
        n++;
    }
    c->nnow = 0;
    if (count) *count = n;
    return status;
}

CLOTH_API cloth_status cloth_collide_exempt(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_exempt", max, pair != NULL);
    int          i;
    if (status) return status;
    for (i = 0; i < max && i < c->nexempt; i++) pair[i] = clothi_couple_public(c, c->exempt + i);
    if (count) *count = c->nexempt;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_failed(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_failed", max, pair != NULL);
    int          i;
    if (status) return status;
    for (i = 0; i < max && i < c->nfailed; i++) pair[i] = c->failed[i];
    if (count) *count = c->nfailed;
    return CLOTH_OK;
}

/* ===== [8.6] UNTANGLING ======================================================================
 *
 *           o   o                   Everything is judged by the cuts: points c where an edge p q of
 *      ____/_\_/_\____  face g      one surface passes a face g of another (or of itself).
 *         /   c   \                     which end is wrong?
 *        p --- p --- p            1   the one inside of a closed obstacle (winding number [7.1])
 *      a corner that poked        2   else the one in the smaller area: cut edges taken out, the
 *      through: p are wrong           edges that are left join the vertices of a surface to areas;
 *                                     all but its largest are on the wrong side     [BWK03]
 *                                 3   neither: the line of cuts has ends inside both [VM06]
 *
 *   1   inside an obstacle      d = q - p + (t/2) (q - p)/|q - p|, q its point nearest to p; where
 *                               an edge passes through with both ends outside, p is midway inside
 *   2   another surface         d = ((c - p).n + t/2) n, n of g, towards the end that is right,
 *                               shared between p and the corners of g as impulses would be:
 *                               dx_i = w_i/m_i / (sum w_k^2/m_k) d, w = 1 and -barycentric (c)
 *   3   shorten the line. In g's plane it leaves c along the unit vector R_f in each face f at the
 *       edge, whose direction is e. A surface that moves by d takes c along by d - e (d.n)/(e.n) as
 *       seen from the other, by -e (d.n)/(e.n) as seen from itself; the length is the same, so the
 *       mean of both will do:    dL = -G.d,   G = sum over f of R_f/2 - n (R_f.e)/(e.n)
 *       for cuts of its edges, +G.d for those of the other's. Edges go along G, g against it; G is
 *       a direction here, the motion of an edge alone is not a surface's.                 [VM06]
 *   4   sphere, capsule, plane  along the normal by depth + t/2, weights as in 2
 *
 *   vertices between: each takes the mean of its neighbours, on the right side damped: the areas
 *   move as a whole and draw what is around them along. At most max_move a vertex.
 *
 * The motion goes through detection and zones [8.3]: pairs clear of the tangle stay clear on their
 * whole path. Let through is what has to pass: pairs of which a vertex is inside the obstacle, and
 * pairs within a ring of faces of the cuts. The line of cuts wanders over the faces between, so
 * that a pair may be new; afterwards exact signs [5.2] look at all of them: only within a ring of a
 * pair that was, or of a face that came from inside. And the whole must be less tangled:
 *       measure = sum over wrong vertices of area (distance to their surface + t)
 *                 + the same of what is in spheres, capsules, planes + t^2 length of the lines
 * has to fall by a thousandth, else half of the motion is tried, a quarter, .. 1/32, else nothing.
 * As it falls in each call that succeeds there is no going round in circles.
 *
 * Let through is not looked at on its path: with max_move well above an edge's length a vertex may
 * be carried past more than it should, which the measure alone judges.
 *
 * Dropped: the material (the motion is geometry; steps between calls give the cloth its shape back
 * and often the room that a deep tangle needs). The way out of a region as a whole: each vertex
 * takes its own, so that a wall thinner than twice the depth may have cloth on both sides. Edges
 * that pass several surfaces: areas know one cut. Two halves of one size, as of sheets that cross
 * in the middle, are told apart by rounding, and what has no edge to be pulled back over (a closed
 * line around a body) may stall.
 *
 * [BWK03] Baraff, Witkin, Kass: Untangling Cloth, SIGGRAPH 2003, doi 10.1145/882262.882357.
 * [VM06]  Volino, Magnenat-Thalmann: Resolving Surface Collisions through Intersection Contour
 *         Minimization, SIGGRAPH 2006, doi 10.1145/1141911.1142007.
 * checked: tests/test_untangle.c */

#define CLOTHI_UNTANGLE_MOVE   5.0          /* t, max_move 0                                   */
#define CLOTHI_UNTANGLE_FALL   1e-3         /* of the measure, in a call                       */
#define CLOTHI_UNTANGLE_TRIES  6
#define CLOTHI_UNTANGLE_SPREAD 12           /* rounds                                          */
#define CLOTHI_UNTANGLE_RING   2.0          /* mean edges: nearer in the template is itself    */

typedef struct clothi_crossing {            /* edge of face `of` through face g                */
    int    edge, face, of;
    int    end;                             /* 0, 1: the wrong end of the edge; -1: neither    */
    double s;                               /* the point c: part of the edge, from its first   */
    double b[3], at[3];                     /* end; barycentric in g; m                        */
} clothi_crossing;

struct clothi_untangle {
    clothi_couple *before;                  /* pairs that intersect, sorted                    */
    int            nbefore;
    clothi_crossing *cut;
    int            ncut, cut_cap;
    double        *d, *g;                   /* [nw x 3] m, motion; shortening                  */
    int           *nd, *ng;                 /* [nw] how many each is the sum of                */
    double        *spread;                  /* [nw x 3]                                        */
    double        *size;                    /* [nw] m^2 of areas, by their root                */
    double        *edge;                    /* [me x 3] m^2 around; parts before the first cut
                                               and behind the last                             */
    double        *depth;                   /* [nw] m of wrong vertices                        */
    int           *area, *piece;            /* [nw] root of its area, of its surface           */
    int           *best;                    /* [nw] largest area, by root of the surface       */
    int           *in;                      /* [nw] slot of the obstacle it is inside of, -1   */
    int           *out;                     /* [nw] slot that it is known to be outside of     */
    int           *hit;                     /* [mf - nf] of rays                               */
    unsigned char *wrong, *near_by;         /* [nw]                                            */
    unsigned char *through;                 /* [me] edges that are cut                         */
    unsigned char *closed;                  /* [mf] faces of closed obstacles                  */
    double         measure;                 /* m^3                                             */
    int            slot;                    /* of the query under way                          */
    const cloth_collide *c;
};

static void clothi_untangle_free(const cloth_hooks *k, clothi_untangle *u) {
    clothi_free(k, u->before);
    clothi_free(k, u->cut);
    clothi_free(k, u->d);
    clothi_free(k, u->nd);
    clothi_free(k, u->wrong);
}

/* Room for all that is as long as the world. */
static cloth_status clothi_untangle_make(cloth_collide *c, clothi_untangle *u) {
    const size_t nw = (size_t)c->nw, mf = (size_t)c->mf;
    cloth_status status = CLOTH_OK;
    int          o, i, open;
    if (u->d) return CLOTH_OK;
    u->c = c;
    u->d = (double *)clothi_alloc(c->hooks, 11 * nw + 3 * (size_t)c->me, sizeof(double));
    u->nd = (int *)clothi_alloc(c->hooks, 7 * nw + mf, sizeof(int));
    u->wrong = (unsigned char *)clothi_alloc(c->hooks, 2 * nw + (size_t)c->me + mf, 1);
    if (!u->d || !u->nd || !u->wrong) return CLOTH_ERR_MEMORY;
    u->g = u->d + 3 * nw, u->spread = u->g + 3 * nw;
    u->size = u->spread + 3 * nw, u->depth = u->size + nw, u->edge = u->depth + nw;
    u->ng = u->nd + nw, u->area = u->ng + nw, u->piece = u->area + nw;
    u->best = u->piece + nw, u->in = u->best + nw, u->out = u->in + nw, u->hit = u->out + nw;
    u->near_by = u->wrong + nw;
    u->through = u->near_by + nw, u->closed = u->through + c->me;
    for (o = 0; o < c->nobstacle && !status; o++) {
        const clothi_obstacle *b = c->obstacle + o;
        if (b->used && b->nf)
            status = clothi_closed_faces(c->hooks, b->nv, b->nf, b->faces, u->closed + b->f0,
                                         &open);
    }
    for (i = 0; i < c->nw; i++) u->piece[i] = i;
    for (i = 0; i < c->features.ne; i++) {
        const int a = clothi_root(u->piece, c->edges[2 * i]);
        const int b = clothi_root(u->piece, c->edges[2 * i + 1]);
        u->piece[a > b ? a : b] = a > b ? b : a;
    }
    for (i = 0; i < c->nw; i++) u->piece[i] = clothi_root(u->piece, i);
    return status;
}

/* --- what is where --- */

/* The edge k of face f and face g at xa: 1 and the cut, when they cross at one point. */
static int clothi_crossing_at(const cloth_collide *c, int f, int k, int g, clothi_crossing *cut) {
    const double *t[3], *p, *q;
    const int    *ends, *v = c->faces + 3 * g;
    double        x[12], w[4], n[3], e1[3], e2[3], a, b, s;
    int           i, sp, sq;
    cut->edge = c->features.face_edges[3 * f + k];
    ends = c->edges + 2 * cut->edge;
    if (clothi_face_has(c, g, ends[0]) || clothi_face_has(c, g, ends[1])) return 0;
    p = c->xa + 3 * ends[0], q = c->xa + 3 * ends[1];
    for (i = 0; i < 3; i++) t[i] = c->xa + 3 * v[i];
    sp = clothi_volume(t[0], t[1], t[2], p);
    sq = clothi_volume(t[0], t[1], t[2], q);
    if ((sp == 0 && sq == 0) || !clothi_edge_meets(p, q, sp, sq, t)) return 0;
    clothi_sub3(t[1], t[0], e1);
    clothi_sub3(t[2], t[0], e2);
    clothi_cross3(e1, e2, n);
    clothi_sub3(p, t[0], e1);
    clothi_sub3(q, t[0], e2);
    a = clothi_dot3(n, e1), b = clothi_dot3(n, e2);
    s = fabs(a) + fabs(b) > 0 ? fabs(a) / (fabs(a) + fabs(b)) : 0.5;
    cut->face = g, cut->of = f, cut->end = -1;
    cut->s = s;
    for (i = 0; i < 3; i++) cut->at[i] = x[i] = p[i] + s * (q[i] - p[i]);
    clothi_gather_points(c->xa, v, 3, x + 3);
    (void)clothi_pair_distance(0, x, w);
    for (i = 0; i < 3; i++) cut->b[i] = -w[1 + i];
    return 1;
}

/* All cuts of the pairs of faces; adds the lengths of the lines to the measure. */
static cloth_status clothi_untangle_cuts(cloth_collide *c, clothi_untangle *u) {
    const clothi_couple *list = u->before;
    cloth_status         status;
    int                  i, k, j, first;
    u->ncut = 0;
    for (i = 0; i < u->nbefore; i++) {
        double length2 = 0;
        if (list[i].kind >= 0) continue;
        for (first = u->ncut, k = 0; k < 6; k++) {
            clothi_crossing cut;
            if (!clothi_crossing_at(c, k < 3 ? list[i].a : list[i].b, k % 3,
                               k < 3 ? list[i].b : list[i].a, &cut))
                continue;
            status = clothi_grow(c->hooks, (void **)&u->cut, u->ncut, &u->cut_cap, sizeof cut);
            if (status) return status;
            u->cut[u->ncut++] = cut;
            for (j = first; j < u->ncut - 1; j++) {
                double d[3];
                clothi_sub3(cut.at, u->cut[j].at, d);
                length2 = clothi_max(length2, clothi_dot3(d, d));
            }
        }
        u->measure += sqrt(length2) * c->desc.thickness * c->desc.thickness;
    }
    return CLOTH_OK;
}

/* Whether p is inside of obstacle `slot`, a mesh: crossings of a ray upwards of closed parts. */
static int clothi_untangle_inside(const cloth_collide *c, clothi_untangle *u, int slot,
                                  const double *p) {
    double ray[6], depth = 0;
    int    i, n, wind = 0;
    for (i = 0; i < 3; i++) ray[i] = ray[3 + i] = p[i];
    ray[5] = CLOTHI_HUGE;
    n = clothi_bvh_box_query(&c->solid, ray, c->mf - c->nf, u->hit);
    for (i = 0; i < n; i++) {
        const int *v = c->faces + 3 * u->hit[i];
        int        turn;
        if (c->slot[v[0]] != slot || !u->closed[u->hit[i]]) continue;
        turn = clothi_line_cross(c->xa + 3 * v[0], c->xa + 3 * v[1], c->xa + 3 * v[2], 2, p[0],
                                 p[1], &depth);
        if (turn && depth > p[2]) wind += turn;
    }
    return c->obstacle[slot].kind == CLOTH_OBSTACLE_BOX ? wind != 0 : wind >= 1;
}

static double clothi_untangle_face2(int f, const double *p, void *ctx) {
    const clothi_untangle *u = (const clothi_untangle *)ctx;
    const cloth_collide   *c = u->c;
    double                 x[12], w[4], d;
    if (c->slot[c->faces[3 * f]] != u->slot || c->off[f] || !u->closed[f]) return HUGE_VAL;
    memcpy(x, p, 3 * sizeof(double));
    clothi_gather_points(c->xa, c->faces + 3 * f, 3, x + 3);
    d = clothi_pair_distance(0, x, w);
    return d * d;
}

/* Point q of the obstacle nearest to p, m away; returns the face, -1: none. */
static int clothi_untangle_nearest(clothi_untangle *u, int slot, const double *p, double *q,
                                   double *away) {
    const cloth_collide *c = u->c;
    double               x[12], w[4], d2 = HUGE_VAL;
    int                  f, i, k;
    *away = 0;
    u->slot = slot;
    f = clothi_bvh_nearest(&c->solid, p, clothi_untangle_face2, u, &d2);
    if (f < 0 || !(d2 < HUGE_VAL)) return -1;
    memcpy(x, p, 3 * sizeof(double));
    clothi_gather_points(c->xa, c->faces + 3 * f, 3, x + 3);
    *away = clothi_pair_distance(0, x, w);
    for (k = 0; k < 3; k++)
        for (q[k] = 0, i = 1; i < 4; i++) q[k] -= w[i] * x[3 * i + k];
    return f;
}

/* Of an edge of the cloth that passes through a closed obstacle, both ends outside, the cut where
 * it enters: 1, p [3] midway and its part s of the edge; the one where it leaves: 2; 0: no such. */
static int clothi_untangle_midway(const cloth_collide *c, clothi_untangle *u,
                                  const clothi_crossing *cut, double *p, double *s) {
    const int    *v = c->edges + 2 * cut->edge;
    const double *e = u->edge + 3 * cut->edge;
    int           k;
    if (cut->end >= 0 || !u->closed[cut->face] || !(e[1] < 1 - e[2])) return 0;
    *s = 0.5 * (e[1] + 1 - e[2]);
    for (k = 0; k < 3; k++) p[k] = c->xa[3 * v[0] + k] * (1 - *s) + c->xa[3 * v[1] + k] * *s;
    if (!clothi_untangle_inside(c, u, c->slot[c->faces[3 * cut->face]], p)) return 0;
    return cut->s > e[1] ? 2 : 1;
}

/* Asks for the corners of a cloth face whether they are inside of the obstacle; 1: one more is. */
static int clothi_untangle_ask(const cloth_collide *c, clothi_untangle *u, int f, int slot) {
    int k, more = 0;
    for (k = 0; k < 3; k++) {
        const int v = c->faces[3 * f + k];
        if (u->in[v] >= 0 || u->out[v] == slot) continue;
        if (clothi_untangle_inside(c, u, slot, c->xa + 3 * v)) u->in[v] = slot, more = 1;
        else u->out[v] = slot;
    }
    return more;
}

/* Cloth vertices inside of closed obstacles, as far as edges lead from the cuts. */
static void clothi_untangle_insides(const cloth_collide *c, clothi_untangle *u) {
    int i, k, more = 1;
    for (i = 0; i < c->nw; i++) u->in[i] = u->out[i] = -1;
    for (i = 0; i < u->nbefore; i++) {
        const int g = u->before[i].b;
        if (u->before[i].kind < 0 && g >= c->nf && u->closed[g])
            (void)clothi_untangle_ask(c, u, u->before[i].a, c->slot[c->faces[3 * g]]);
    }
    while (more)
        for (more = 0, i = 0; i < c->nf; i++)
            for (k = 0; k < 3; k++) {
                const int slot = u->in[c->faces[3 * i + k]];
                if (slot >= 0) more |= clothi_untangle_ask(c, u, i, slot);
            }
}

/* What each area holds: a third of a face for each of its edges, of a cut edge what is before the
 * first cut and behind the last. Vertices would not do: a box has no more above than below. */
static void clothi_untangle_sizes(const cloth_collide *c, clothi_untangle *u) {
    int i, k;
    memset(u->size, 0, (size_t)c->nw * sizeof(double));
    for (i = 0; i < c->me; i++) u->edge[3 * i] = 0, u->edge[3 * i + 1] = u->edge[3 * i + 2] = 1;
    for (i = 0; i < c->mf; i++) {
        const int *v = c->faces + 3 * i;
        double     p[3], q[3], n[3];
        clothi_sub3(c->xa + 3 * v[1], c->xa + 3 * v[0], p);
        clothi_sub3(c->xa + 3 * v[2], c->xa + 3 * v[0], q);
        clothi_cross3(p, q, n);
        for (k = 0; k < 3; k++)
            u->edge[3 * c->features.face_edges[3 * i + k]] += sqrt(clothi_dot3(n, n)) / 6;
    }
    for (i = 0; i < u->ncut; i++) {
        double *e = u->edge + 3 * u->cut[i].edge;
        e[1] = clothi_min(e[1], u->cut[i].s);
        e[2] = clothi_min(e[2], 1 - u->cut[i].s);
    }
    for (i = 0; i < c->features.ne; i++) {
        const double *e = u->edge + 3 * i;
        if (u->through[i]) {
            u->size[u->area[c->edges[2 * i]]] += e[0] * e[1];
            u->size[u->area[c->edges[2 * i + 1]]] += e[0] * e[2];
        } else
            u->size[u->area[c->edges[2 * i]]] += e[0];
    }
}

/* The areas that cuts leave of each surface; all but the largest are wrong. */
static void clothi_untangle_areas(const cloth_collide *c, clothi_untangle *u) {
    int i;
    memset(u->through, 0, (size_t)c->me);
    for (i = 0; i < u->ncut; i++)           /* a closed obstacle knows what is inside */
        if (!u->closed[u->cut[i].face]) u->through[u->cut[i].edge] = 1;
    for (i = 0; i < c->nw; i++) u->area[i] = i, u->best[i] = -1;
    for (i = 0; i < c->features.ne; i++) {
        const int a = clothi_root(u->area, c->edges[2 * i]);
        const int b = clothi_root(u->area, c->edges[2 * i + 1]);
        if (!u->through[i]) u->area[a > b ? a : b] = a > b ? b : a;
    }
    for (i = 0; i < c->nw; i++) u->area[i] = clothi_root(u->area, i);
    clothi_untangle_sizes(c, u);
    for (i = 0; i < c->nw; i++) {
        int *best = u->best + u->piece[i];
        if (u->area[i] == i && (*best < 0 || u->size[i] > u->size[*best])) *best = i;
    }
    for (i = 0; i < c->nw; i++) u->wrong[i] = u->area[i] != u->best[u->piece[i]];
    for (i = 0; i < u->ncut; i++) {
        const int *v = c->edges + 2 * u->cut[i].edge, g = u->cut[i].face;
        const int  p = u->area[v[0]], q = u->area[v[1]], slot = c->slot[c->faces[3 * g]];
        if (u->closed[g]) {
            const int a = u->in[v[0]] == slot, b = u->in[v[1]] == slot;
            u->cut[i].end = a == b ? -1 : b;
        } else if (p != q)
            u->cut[i].end = u->size[p] < u->size[q] || (!(u->size[q] < u->size[p]) && p > q)
                                ? 0 : 1;
    }
}

/* Depth of what is wrong, and the measure, at xa. Returns the depth of the
 * deepest, m; *count: of cloth vertices. */
static double clothi_untangle_depths(const cloth_collide *c, clothi_untangle *u, int *count) {
    const double t = c->desc.thickness;
    double       deepest = 0, p[3], q[3], d[3], s, away;
    int          i, j;
    *count = 0;
    for (i = 0; i < c->nw; i++) {
        u->depth[i] = 0;
        if (u->in[i] >= 0) {
            (void)clothi_untangle_nearest(u, u->in[i], c->xa + 3 * i, q, u->depth + i);
        } else if (u->wrong[i]) {
            double least = HUGE_VAL;
            for (j = 0; j < u->ncut; j++) {
                clothi_sub3(u->cut[j].at, c->xa + 3 * i, d);
                least = clothi_min(least, clothi_dot3(d, d));
            }
            u->depth[i] = least < HUGE_VAL ? sqrt(least) : 0;
        } else
            continue;
        *count += i < c->nv;
        u->measure += c->area[i] * (u->depth[i] + t);
        deepest = clothi_max(deepest, u->depth[i]);
    }
    for (i = 0; i < u->ncut; i++) {
        const int slot = c->slot[c->faces[3 * u->cut[i].face]];
        if (clothi_untangle_midway(c, u, u->cut + i, p, &s) != 1) continue;
        (void)clothi_untangle_nearest(u, slot, p, q, &away);
        u->measure += u->edge[3 * u->cut[i].edge] * (away + t);
        deepest = clothi_max(deepest, away);
    }
    for (i = 0; i < u->nbefore; i++) {
        const clothi_couple *k = u->before + i;
        double               gap;
        if (k->kind < 0) continue;
        gap = clothi_lone_gap(c, c->xa, k->kind, k->a, k->b);
        u->measure += c->sim->edge * c->sim->edge * (t - gap);
        deepest = clothi_max(deepest, -gap);
    }
    return deepest;
}

/* Corners of the faces within a ring of those that intersect. */
static void clothi_untangle_ring(const cloth_collide *c, clothi_untangle *u) {
    int i, k;
    memset(u->near_by, 0, (size_t)c->nw);
    for (i = 0; i < u->nbefore; i++)
        for (k = 0; k < 6 && u->before[i].kind < 0; k++)
            u->near_by[c->faces[3 * (k < 3 ? u->before[i].a : u->before[i].b) + k % 3]] = 1;
    for (i = 0; i < c->mf; i++) {
        const int *v = c->faces + 3 * i;
        if (u->near_by[v[0]] != 1 && u->near_by[v[1]] != 1 && u->near_by[v[2]] != 1) continue;
        for (k = 0; k < 3; k++) u->near_by[v[k]] |= 2 * !u->near_by[v[k]];
    }
}

/* --- where it should go --- */

/* 1/kg; 0 for what does not move. */
static double clothi_untangle_give(const cloth_collide *c, int v) {
    return v >= c->nv || (c->sim->pin[v] & CLOTH_AXIS_ALL) == CLOTH_AXIS_ALL
               ? 0 : 1 / c->sim->params.mass[v];
}

/* n . sum w x is to grow by `by` (m): its vertices share that. */
static void clothi_untangle_push(const cloth_collide *c, clothi_untangle *u, const int *v,
                                 const double *w, int count, const double *n, double by) {
    double sum = 0;
    int    i, k;
    for (i = 0; i < count; i++) sum += w[i] * w[i] * clothi_untangle_give(c, v[i]);
    for (i = 0; i < count && sum > 0; i++) {
        const double share = w[i] * clothi_untangle_give(c, v[i]) / sum * by;
        if (!(fabs(share) > 0)) continue;
        for (k = 0; k < 3; k++) u->d[3 * v[i] + k] += share * n[k];
        u->nd[v[i]]++;
    }
}

static void clothi_untangle_normal(const cloth_collide *c, int f, double *n) {
    const int *v = c->faces + 3 * f;
    double     p[3], q[3], size;
    int        k;
    clothi_sub3(c->xa + 3 * v[1], c->xa + 3 * v[0], p);
    clothi_sub3(c->xa + 3 * v[2], c->xa + 3 * v[0], q);
    clothi_cross3(p, q, n);
    size = sqrt(clothi_dot3(n, n));
    for (k = 0; k < 3; k++) n[k] = size > 0 ? n[k] / size : 0;
}

/* Kind 1: the point at part s from vertex a to vertex b leaves obstacle `slot`. */
static void clothi_untangle_leave(const cloth_collide *c, clothi_untangle *u, int slot, int a,
                                  int b, double s) {
    const double gap = CLOTHI_GAP * c->desc.thickness;
    double       p[3], q[3], n[3], w[2], away;
    int          v[2], k, f;
    for (k = 0; k < 3; k++) p[k] = c->xa[3 * a + k] * (1 - s) + c->xa[3 * b + k] * s;
    f = clothi_untangle_nearest(u, slot, p, q, &away);
    if (f < 0) return;
    clothi_untangle_normal(c, f, n);
    for (k = 0; k < 3 && away > 1e-3 * gap; k++) n[k] = (q[k] - p[k]) / away;
    v[0] = a, v[1] = b;
    w[0] = 1 - s, w[1] = s;
    clothi_untangle_push(c, u, v, w, a == b ? 1 : 2, n, away + gap);
}

/* Kind 2: the wrong end of a cut edge goes back through the face. */
static void clothi_untangle_back(const cloth_collide *c, clothi_untangle *u,
                                 const clothi_crossing *cut) {
    const int *ends = c->edges + 2 * cut->edge;
    double     n[3], d[3], w[4], by;
    int        v[4], k;
    v[0] = ends[cut->end];
    if (u->in[v[0]] >= 0) return;           /* has its own way out */
    w[0] = 1;
    for (k = 0; k < 3; k++) v[1 + k] = c->faces[3 * cut->face + k], w[1 + k] = -cut->b[k];
    clothi_untangle_normal(c, cut->face, n);
    clothi_sub3(c->xa + 3 * ends[!cut->end], c->xa + 3 * v[0], d);
    by = clothi_dot3(n, d);
    for (k = 0; k < 3 && by < 0; k++) n[k] = -n[k];
    clothi_sub3(cut->at, c->xa + 3 * v[0], d);
    by = clothi_max(clothi_dot3(n, d), 0) + CLOTHI_GAP * c->desc.thickness;
    clothi_untangle_push(c, u, v, w, 4, n, by);
}

/* Kind 3: what the face `of` adds to G. */
static void clothi_untangle_shorten(const cloth_collide *c, clothi_untangle *u,
                                    const clothi_crossing *cut) {
    const int *ends = c->edges + 2 * cut->edge, *f = c->faces + 3 * cut->of;
    const int  third = f[0] + f[1] + f[2] - ends[0] - ends[1];
    double     n[3], m[3], r[3], e[3], in[3], along, size, part;
    int        k, moves = 0, i;
    clothi_untangle_normal(c, cut->face, n);
    clothi_untangle_normal(c, cut->of, m);
    clothi_cross3(n, m, r);
    clothi_sub3(c->xa + 3 * ends[1], c->xa + 3 * ends[0], e);
    clothi_sub3(c->xa + 3 * third, c->xa + 3 * ends[0], in);
    size = sqrt(clothi_dot3(r, r));
    along = sqrt(clothi_dot3(e, e));
    if (!(size > 0) || !(along > 0)) return;
    for (k = 0; k < 3; k++) r[k] /= size, e[k] /= along;
    along = clothi_dot3(in, e);
    for (k = 0; k < 3; k++) in[k] -= along * e[k];
    part = clothi_dot3(r, in) < 0 ? -1 : 1;             /* into the face */
    along = clothi_dot3(e, n);
    along = fabs(along) > 0.05 ? along : along < 0 ? -0.05 : 0.05;
    along = clothi_dot3(r, e) / along;
    for (k = 0; k < 3; k++) r[k] = part * (0.5 * r[k] - along * n[k]);
    for (i = 0; i < 5; i++) moves |= clothi_untangle_give(c, i < 2 ? ends[i]
                                     : c->faces[3 * cut->face + i - 2]) > 0 ? i < 2 ? 1 : 2 : 0;
    part = moves == 3 ? 0.5 : 1;
    for (i = 0; i < 5; i++) {
        const int v = i < 2 ? ends[i] : c->faces[3 * cut->face + i - 2];
        for (k = 0; k < 3; k++) u->g[3 * v + k] += (i < 2 ? part : -part) * r[k];
        u->ng[v]++;
    }
}

/* Kind 4: a pair with a sphere, a capsule, a plane. */
static void clothi_untangle_lone(const cloth_collide *c, clothi_untangle *u,
                                 const clothi_couple *p) {
    double x[12], w[4], n[3] = {0, 0, 0}, gap = clothi_lone_gap(c, c->xa, p->kind, p->a, p->b);
    double size;
    int    v[4], i, k, count = clothi_pair_vertices(c, p->kind, p->a, p->b, v);
    if (p->kind == CLOTHI_VP) {
        w[0] = 1, w[1] = -1;
        memcpy(n, c->obstacle[p->b].normal, sizeof n);
    } else {
        clothi_gather_points(c->xa, v, 4, x);
        (void)clothi_pair_distance(p->kind, x, w);
        for (i = 0; i < 4; i++)
            for (k = 0; k < 3; k++) n[k] += w[i] * x[3 * i + k];
        size = sqrt(clothi_dot3(n, n));
        for (k = 0; k < 3 && size > 0; k++) n[k] /= size;
        if (!(size > 0) && p->kind == CLOTHI_VF) clothi_untangle_normal(c, p->b, n);
        if (!(size > 0) && p->kind == CLOTHI_EE) {
            double a[3], b[3];
            clothi_sub3(x + 3, x, a);
            clothi_sub3(x + 9, x + 6, b);
            clothi_cross3(a, b, n);
            size = sqrt(clothi_dot3(n, n));
            for (k = 0; k < 3 && size > 0; k++) n[k] /= size;
        }
    }
    clothi_untangle_push(c, u, v, w, count, n, CLOTHI_GAP * c->desc.thickness - gap);
}

/* Means, the length of kind 3, and the vertices between. */
static void clothi_untangle_spread(const cloth_collide *c, clothi_untangle *u, double most) {
    int i, k, round;
    for (i = 0; i < c->nv; i++) {
        double *d = u->d + 3 * i, *g = u->g + 3 * i;
        if (u->nd[i]) {
            for (k = 0; k < 3; k++) d[k] /= u->nd[i];
        } else if (u->ng[i]) {
            const double size = sqrt(clothi_dot3(g, g)) / u->ng[i];
            const double grow = most / sqrt(size * size + 0.01) / u->ng[i];
            for (k = 0; k < 3; k++) d[k] = grow * g[k];
        }
        u->nd[i] += u->ng[i];
        if ((c->sim->pin[i] & CLOTH_AXIS_ALL) == CLOTH_AXIS_ALL) {
            d[0] = d[1] = d[2] = 0;
            u->nd[i] = 1;
        }
    }
    for (round = 0; round < CLOTHI_UNTANGLE_SPREAD; round++) {
        memset(u->spread, 0, 3 * (size_t)c->nw * sizeof(double));
        for (i = 0; i < c->nv; i++) u->size[i] = u->wrong[i] || u->in[i] >= 0 ? 0 : 1;
        for (i = 0; i < c->features.ne; i++) {
            const int a = c->edges[2 * i], b = c->edges[2 * i + 1];
            if (a >= c->nv) continue;
            for (k = 0; k < 3; k++) {
                u->spread[3 * a + k] += u->d[3 * b + k];
                u->spread[3 * b + k] += u->d[3 * a + k];
            }
            u->size[a] += 1, u->size[b] += 1;
        }
        for (i = 0; i < c->nv; i++)
            for (k = 0; k < 3 && !u->nd[i] && u->size[i] > 0; k++)
                u->d[3 * i + k] = u->spread[3 * i + k] / u->size[i];
    }
    for (i = 0; i < c->nv; i++) {
        double      *d = u->d + 3 * i;
        const double size = sqrt(clothi_dot3(d, d));
        for (k = 0; k < 3; k++) {
            if (size > most) d[k] *= most / size;
            if (c->sim->pin[i] >> k & 1) d[k] = 0;
        }
    }
}

/* The motion of this call into u->d. */
static void clothi_untangle_motion(const cloth_collide *c, clothi_untangle *u, double most) {
    int i;
    memset(u->d, 0, 6 * (size_t)c->nw * sizeof(double));
    memset(u->nd, 0, 2 * (size_t)c->nw * sizeof(int));
    for (i = 0; i < c->nv; i++)
        if (u->in[i] >= 0) clothi_untangle_leave(c, u, u->in[i], i, i, 0);
    for (i = 0; i < u->ncut; i++) {
        const clothi_crossing *cut = u->cut + i;
        double                 p[3], s;
        const int              way = clothi_untangle_midway(c, u, cut, p, &s);
        if (way == 1)
            clothi_untangle_leave(c, u, c->slot[c->faces[3 * cut->face]], c->edges[2 * cut->edge],
                                  c->edges[2 * cut->edge + 1], s);
        else if (!way && cut->end >= 0) clothi_untangle_back(c, u, cut);
        else if (!way) clothi_untangle_shorten(c, u, cut);
    }
    for (i = 0; i < u->nbefore; i++)
        if (u->before[i].kind >= 0) clothi_untangle_lone(c, u, u->before + i);
    clothi_untangle_spread(c, u, most);
}

/* --- what may pass --- */

/* Pairs that detection lets through while a tangle is moved. */
static int clothi_untangle_lets(const cloth_collide *c, int kind, int a, int b) {
    const clothi_untangle *u = c->untangle;
    const int              slot = clothi_pair_slot(c, kind, a, b);
    double                 x[12], w[4];
    int                    v[4], i, n = clothi_pair_vertices(c, kind, a, b, v), all = 1;
    for (i = 0; i < n; i++) {
        if (slot >= 0 && v[i] < c->nv && u->in[v[i]] == slot) return 1;
        all = all && u->near_by[v[i]];
    }
    if (!all || n < 4) return 0;
    if (slot >= 0 || u->piece[v[0]] != u->piece[v[3]]) return 1;
    clothi_gather_points(c->sim->model->x_rest, v, 4, x);
    return clothi_pair_distance(kind, x, w) > CLOTHI_UNTANGLE_RING * c->sim->edge;
}

/* Whether p, which intersects now, did before: 1; or is a ring away from one that did: 2. */
static int clothi_untangle_knew(const cloth_collide *c, const clothi_untangle *u,
                                const clothi_couple *p) {
    int i, k;
    for (i = 0; i < u->nbefore; i++)
        if (clothi_pair_compare(u->before + i, p) == 0) return 1;
    if (p->kind >= 0) return 0;
    for (k = 0; k < 3 && p->b >= c->nf; k++)
        if (u->in[c->faces[3 * p->a + k]] == c->slot[c->faces[3 * p->b]]) return 2;
    return clothi_couples_beside(c, u->before, u->nbefore, p->a, p->b) ? 2 : 0;
}

/* --- a call --- */

/* xb is where it should go, xa where it is; xb where zones let it. CLOTH_ERR_STEP: nowhere. */
static cloth_status clothi_untangle_resolve(cloth_collide *c) {
    cloth_status status = CLOTH_OK;
    int          hit = 0, first;
    memcpy(c->x_ie, c->xb, 3 * (size_t)c->nv * sizeof(double));
    memset(c->moved, 1, (size_t)c->nv);
    memset(c->frozen, 0, (size_t)c->nv);
    c->nrow = c->nin = c->nout = 0;
    c->report.passes = 0;
    c->solid_known = 0;
    while (!status) {
        first = c->nrow;
        status = clothi_detect(c, &hit);
        if (status || hit == 0) break;
        if (c->hooks->cancel.fn && c->hooks->cancel.fn(c->hooks->cancel.user))
            return CLOTH_ERR_CANCELLED;
        if (++c->report.passes > c->desc.max_passes + CLOTHI_RIGID_PASSES) return CLOTH_ERR_STEP;
        status = clothi_zones(c, first);
    }
    return status;
}

/* Everything about the pairs c->now at xa: cuts, insides, areas, depths, the measure. */
static cloth_status clothi_untangle_look(cloth_collide *c, clothi_untangle *u, double *deepest,
                                         int *count) {
    cloth_status status = clothi_untangle_make(c, u);
    if (status) return status;
    clothi_free(c->hooks, u->before);
    u->nbefore = c->nnow;
    u->measure = 0;
    u->before = (clothi_couple *)clothi_alloc(c->hooks, (size_t)c->nnow, sizeof *u->before);
    if (!u->before) return CLOTH_ERR_MEMORY;
    memcpy(u->before, c->now, (size_t)c->nnow * sizeof *u->before);
    status = clothi_untangle_cuts(c, u);
    if (status) return status;
    clothi_untangle_insides(c, u);
    clothi_untangle_areas(c, u);
    *deepest = clothi_untangle_depths(c, u, count);
    return CLOTH_OK;
}

/* One try at `part` of the motion. *good: xb may be taken, and c->now are its pairs. Failures of
 * zones are a try that is not good. */
static cloth_status clothi_untangle_try(cloth_collide *c, clothi_untangle *u, clothi_untangle *w,
                                        double part, cloth_untangle_report *r, int *good) {
    cloth_status status;
    double       deepest, d[3];
    int          i, k, count;
    *good = 0;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    for (i = 0; i < 3 * c->nv; i++) c->xb[i] += part * u->d[i];
    memcpy(c->now, u->before, (size_t)u->nbefore * sizeof *c->now);
    c->nnow = u->nbefore;
    c->untangle = u;
    status = clothi_untangle_resolve(c);
    c->untangle = NULL;
    if (status) return status == CLOTH_ERR_STEP ? CLOTH_OK : status;
    if (clothi_find_nonfinite(c->xb, 3 * (size_t)c->nv) >= 0) return CLOTH_OK;
    memcpy(u->spread, c->xb, 3 * (size_t)c->nv * sizeof(double));
    clothi_world_pose(c, u->spread, 0, 0);
    c->nnow = 0;
    status = clothi_crossings(c, 0);
    for (r->wandered = 0, i = 0; i < c->nnow && !status; i++) {
        const int known = clothi_untangle_knew(c, u, c->now + i);
        if (!known) return CLOTH_OK;
        r->wandered += known == 2;
    }
    if (!status) status = clothi_untangle_look(c, w, &deepest, &count);
    if (status) return status;
    *good = w->measure <= (1 - CLOTHI_UNTANGLE_FALL) * u->measure;
    for (r->moved = 0, i = 0; i < c->nv; i++) {
        for (k = 0; k < 3; k++) d[k] = u->spread[3 * i + k] - c->sim->state.x[3 * i + k];
        r->moved = clothi_max(r->moved, sqrt(clothi_dot3(d, d)));
    }
    return CLOTH_OK;
}

/* No vertex of the cloth in it can move. */
static int clothi_untangle_held(const cloth_collide *c, const clothi_couple *p) {
    int v[6], i, n = 6;
    if (p->kind >= 0) n = clothi_pair_vertices(c, p->kind, p->a, p->b, v);
    else
        for (i = 0; i < 6; i++) v[i] = c->faces[3 * (i < 3 ? p->a : p->b) + i % 3];
    for (i = 0; i < n; i++)
        if (clothi_untangle_give(c, v[i]) > 0) return 0;
    return 1;
}

/* Nothing helps: the pairs are listed, the one to look at is named. */
static cloth_status clothi_untangle_stalled(cloth_collide *c, const clothi_untangle *u,
                                            cloth_untangle_report *r) {
    cloth_status status;
    int          i, at = 0;
    for (i = 0; i < u->nbefore && !r->held; i++)
        if (clothi_untangle_held(c, u->before + i)) r->held = 1, at = i;
    memcpy(c->now, u->before, (size_t)u->nbefore * sizeof *c->now);
    c->nnow = u->nbefore;
    status = clothi_list_now(c);
    if (status) return status;
    r->stalled = 1;
    r->pair = c->failed[at];
    return clothi_fail(c->hooks, CLOTH_ERR_STEP,
                       "untangling: %i pairs intersect and no motion of the free vertices that was "
                       "tried makes them less; %s: cloth's %s %i and %s %i of %s", u->nbefore,
                       r->held ? "all vertices are pinned of" : "the first",
                       r->pair.faces ? "face" : "vertex or edge", r->pair.a,
                       r->pair.faces ? "face" : "face, edge or slot", r->pair.b,
                       r->pair.obstacle.id ? "an obstacle" : "cloth");
}

/* The cloth goes to u->spread; c->now become its exempt pairs. */
static void clothi_untangle_accept(cloth_collide *c, const double *x) {
    clothi_couple *swap = c->exempt;
    const int      cap = c->exempt_cap;
    memcpy(c->sim->state.x, x, 3 * (size_t)c->nv * sizeof(double));
    cloth_sim_state_changed(c->sim);
    c->exempt = c->now, c->nexempt = c->nnow, c->exempt_cap = c->now_cap;
    c->now = swap, c->nnow = 0, c->now_cap = cap;
    c->seen = clothi_contact_seen(c);
    if (c->desc.initial == CLOTH_INITIAL_REFUSE && c->nexempt) {
        c->nexempt = 0;
        c->seen = 0;                        /* the next step looks, and refuses what is left */
    }
    c->nanchor = 0;
}

static cloth_status clothi_untangle_run(cloth_collide *c, clothi_untangle *u, clothi_untangle *w,
                                        double most, cloth_untangle_report *r, int *good) {
    cloth_status status;
    double       part = 1;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    c->solid_known = 0;
    status = clothi_inside_faces(c);
    c->nnow = 0;
    if (!status) status = clothi_crossings(c, 0);
    if (status) return status;
    r->before = r->after = c->nnow;
    if (c->nnow == 0) {                     /* all have parted */
        c->nexempt = 0;
        c->seen = clothi_contact_seen(c);
        return CLOTH_OK;
    }
    status = clothi_untangle_look(c, u, &r->depth, &r->vertices);
    if (status) return status;
    clothi_untangle_ring(c, u);
    clothi_untangle_motion(c, u, most);
    for (*good = 0; r->tries < CLOTHI_UNTANGLE_TRIES && !*good && !status; part *= 0.5) {
        r->tries++;
        status = clothi_untangle_try(c, u, w, part, r, good);
    }
    if (status || !*good) return status;
    r->after = c->nnow;
    clothi_untangle_accept(c, u->spread);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_untangle(cloth_collide *c, double max_move,
                                              cloth_untangle_report *report) {
    cloth_untangle_report local, *r = report ? report : &local;
    cloth_collide_report  kept;
    clothi_untangle       u, w;
    const cloth_hooks    *hooks;
    cloth_hooks           quiet;
    cloth_status          status;
    int                   good = 1;
    memset(r, 0, sizeof *r);
    if (!c) return CLOTH_ERR_ARGUMENT;
    status = clothi_desc_number(c->hooks, "cloth_collide_untangle: max_move", max_move, 0);
    if (!status) status = clothi_look_check(c);
    if (status) return status;
    if (!(max_move > 0)) max_move = CLOTHI_UNTANGLE_MOVE * c->desc.thickness;
    memset(&u, 0, sizeof u);
    memset(&w, 0, sizeof w);
    kept = c->report;
    hooks = c->hooks;
    quiet = *hooks;                         /* tries that fail are not the answer */
    quiet.log.fn = NULL;
    c->hooks = &quiet;
    c->nfailed = 0;
    status = clothi_untangle_run(c, &u, &w, max_move, r, &good);
    c->hooks = hooks;
    kept.exempt_pairs = c->nexempt;
    c->report = kept;
    if (r->tries) c->nrow = c->ntouch = 0;
    if (!status && !good) status = clothi_untangle_stalled(c, &u, r);
    else if (status && status != CLOTH_ERR_CANCELLED)
        clothi_fail(hooks, status, "untangling %i pairs: %s", r->before, cloth_status_text(status));
    clothi_untangle_free(hooks, &u);
    clothi_untangle_free(hooks, &w);
    return status;
}

/* ===== [9.1] CHANGES =========================================================================
 *
 * 0.1.0  first version. MIT licence: the text in LICENSE holds for this file.
 */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
