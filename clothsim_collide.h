/* clothsim_collide.h - what cloth may not pass through.                       version 0.2.0
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
 *     [4.1] CONTINUOUS DETECTION             [5.1] HIERARCHY
 *     [5.2] TRIANGLES THAT INTERSECT         [6.1] QUADRATIC PROGRAM
 *     [7.1] CLOSED SURFACES, DISTANCE GRID
 *     [8.1] SCENE                            [8.2] PROXIMITY AND FRICTION
 *     [8.3] PINCHES                          [8.4] IMPACT ZONES
 *     [8.5] THE CONTACT IN THE STEP          [8.6] QUERIES
 *     [8.7] UNTANGLING                       [8.8] DERIVATIVES
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
 *         cloth_desc_set_mesh(&desc, sheet);
 *         desc.hooks.log.fn = cloth_log_stderr;                               // says what is wrong
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
 * which every move of the minimiser passes; the potential only decides where the cloth goes.
 *
 * EXEMPT FROM IT
 *   - pairs that intersect at the start, or touch (nearer than t/50 000: cloth laid on something
 *     exactly), where they are let in (CLOTH_INITIAL_EXEMPT), until they have parted, and those
 *     beside them to which the line of intersection wanders: report.exempt_pairs. Any side may
 *     become theirs: cloth_collide_untangle() before the first step pushes them apart
 *   - cloth that is held in a pinch of a self_penetrating body, where two parts of it come nearer
 *     than cloth has room for: report.held vertices, cloth_collide_holds(); against
 *     report.exempt_faces of the body around it. What intersects so is listed with the exempt
 *     pairs [8.3]. No free vertex goes into the body, and cloth does not pass cloth
 *   - parts and obstacles whose category and mask exclude each other
 *   - distance grids (CLOTH_OBSTACLE_GRID): a potential alone. Vertices may sink in under load,
 *     faces and edges cut through; cloth may begin inside and is led out [8.2]
 *   - a teleported obstacle: the jump itself is not looked at, only where it ends
 *   - the path between the ends of a step is looked at as straight lines: an obstacle that turns
 *     far in one step cuts its corners, by 1 - cos(angle/2) of its radius: step shorter
 *   - leapfrog: zones alone, at each of report.substeps: no potential, no friction, no record of
 *     forces but of the last substep. It gains no energy
 *   - statics: refused for a sim that has contact
 *
 * ENERGY. Among obstacles that rest a step goes downhill from a feasible point no worse than where
 * it began: an impact gives no energy but by what a search at its cap leaves undone.
 *
 * NOT PROMISED. That a step succeeds: one in which obstacles close on cloth to less than t/4 a side
 * has no answer; shorter ones may. That Newton converges: after CLOTHI_CONTACT_CAP iterations it
 * ends where it is, feasible, CLOTH_STEP_MAX_ITERATIONS; garments in pinches do in a fifth of them.
 *
 * COSTS, on one core at gcc -O2, in ms of CPU a step of 1/60 s:
 *   sheet 32 x 32 on a sphere (12_drape.c)                     29, obstacles alone 15; 90 steps
 *   T-shirt of 10 000 faces on a walking body of 27 000        500 to 10 000
 * Steps in which parts of a body pass each other around held cloth have 2 to 4 substeps [8.3].
 * It grows with pairs in range rather than with faces: a cloth folded many times can cost ten times
 * the same cloth spread out. Without desc.contact nothing is called and nothing allocated.
 *
 * EACH PARAMETER              what more of it does to the result | to the cost and the promise
 *   thickness    t: layers feel each other from t on and rest a little nearer | more pairs, which
 *                is what costs. A fifth of an edge's length is a good size; much over an edge,
 *                neighbours but one are pairs. Too thin: t/4 nears rounding, pushes get stiffer
 *   stiffness    0 follows the weight. More: closer to t, less sinking under load | worse
 *                condition, more Newton iterations. The promise does not depend on it
 *   relaxation   slower rise after an impact | damping is implicit, about free
 *   friction     Coulomb's mu, cloth on cloth; each obstacle has its own | 0 is the fastest: its
 *                terms are the last that Newton settles
 *   slip         give before a contact that sticks holds fully | smaller: stiffer, more iterations;
 *                larger: visible give, though no creep. A slide at 0.99 tan a begins 0.1 % late
 *   max_passes   rounds of detection and zones | fewer: hard steps fail sooner and cheaper
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
 * other, else 0 and 1. toi may be NULL.
 *   - Never 0 for a true contact: coplanar motion, parallel edges, edges and faces of no length or
 *     area, contact at the start or at the end, any scale.
 *   - At every time before *toi the distance is greater than min_sep. At *toi it is at most
 *     min_sep + 1e-6 min_sep + 3e-14 size, size the largest difference between the two; where a
 *     sliver turns far, or both turn and meet at a side, 256 steps may end at twice min_sep.
 *   - Within min_sep at the start: 1 and 0, also when the two part.
 *   - 1 is a false alarm where the least distance is between min_sep and that. With min_sep = 0 a
 *     second look with twice the digits leaves those below 1e-28 size, and few below 1e-15.
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
    int    factorizations;      /* of an active set: of what comes after the first row changed */
    int    active;              /* rows with lambda > 0; 0 when infeasible                     */
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
 * in   opt      NULL: defaults
 * out  x        [n] m. Infeasible: x0
 * out  lambda   [m] >= 0, kg m per unit of the row.  x = x0 - minv o (G' lambda).
 *               Infeasible: a certificate: max 1, |G_free' lambda| <= 1e-10 max|G| of rows with
 *               lambda > 0, lambda.(h - G_fixed x0_fixed) < 0 by more than rounding; rows that
 *               contradict each other but for less than that count as infeasible
 * out  rep      any of the three may be NULL
 * returns CLOTH_OK, whatever the outcome; CLOTH_ERR_ARGUMENT, _NONFINITE: a sentence names the
 *   field and its value; _UNINIT; _MEMORY; _CAPACITY: the matrix of the rows would have more than
 *   2^31 entries; _CANCELLED. x and lambda are as before then.
 * The same input gives the same bits, whatever work is. A guess can change them only where the
 * optimum has several active sets or the outcome is not SOLVED.
 * contract: alloc none with work of a similar solve behind it, else O(size) | cost about 5
 *   factorizations of the active rows, O(m p^2), p their mean profile | threads: distinct work */
CLOTH_API cloth_status cloth_qp_solve(const cloth_qp *qp, const cloth_qp_options *opt, double *x,
                                      double *lambda, cloth_qp_report *rep);

/* *out: owned; keeps the memory of the largest solve. hooks: copied. OK, _ARGUMENT, _MEMORY */
CLOTH_API cloth_status cloth_qp_work_create(const cloth_hooks *hooks, cloth_qp_work **out);
CLOTH_API void   cloth_qp_work_destroy(cloth_qp_work *work);
CLOTH_API size_t cloth_qp_work_bytes(const cloth_qp_work *work);

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* Which faces of a mesh intersect each other at given positions, decided exactly.          [5.2]
 * Two faces intersect when, as closed triangles, they have a point in common that is not on a
 * vertex or an edge that both name: touching counts, neighbours along an edge count only when
 * folded onto each other in one plane, faces with the same three vertices never. A mesh that is not
 * welded touches itself all along its seams.
 * in   x          [nv x 3] m, finite; exact where 0 or 1e-85 < |x| < 1e85           [3.1]
 * in   faces      [nf x 3], no corner twice; any set of triangles, also without area
 * out  pairs      [max_pairs x 2] faces i < j in increasing order, the first; NULL: max_pairs 0
 * out  count      how many there are in all, may be NULL; 0 on failure
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT; CLOTH_ERR_MESH: an index out of range or a corner twice;
 *   CLOTH_ERR_NONFINITE; CLOTH_ERR_MEMORY; CLOTH_ERR_CAPACITY: more than 2^30 pairs
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
 *   phi is the distance to the boundary of the union, to rounding, where that is below the band,
 *   else the band; its sign is right but for nodes within rounding of the mesh. A face that another
 *   cuts or touches counts whole: by such a place phi may be the distance to its hidden part.
 * returns CLOTH_OK; CLOTH_ERR_UNINIT; CLOTH_ERR_ARGUMENT, _NONFINITE; CLOTH_ERR_MESH: an index out
 *   of range, an edge where the mesh is open or badly oriented, the volume not positive;
 *   CLOTH_ERR_CAPACITY: more than max_nodes; CLOTH_ERR_MEMORY. Logged, with the place.
 * contract: alloc one block and scratch (500 bytes a face) | cost: signs O(nf + area in cells),
 *   then a nearest-face query, ~2 us, per node of the band, ~0.3 us elsewhere | hooks.parallel, the
 *   same bits for any workers */
CLOTH_API cloth_status cloth_grid_create(const cloth_grid_desc *desc, cloth_grid **out);
CLOTH_API void cloth_grid_destroy(cloth_grid *grid);
CLOTH_API size_t cloth_grid_bytes(const cloth_grid *grid);   /* 8 a node and about 250; NULL: 0 */

/* phi at x (m) by trilinear interpolation, and the gradient of the interpolant (on the border of
 * two cells that of the upper one). Outside the grid sqrt(|x - q|^2 + phi(q)^2), q the nearest
 * point of the grid: continuous, and never above the distance that |x - q| and phi(q) allow.
 * out  distance, gradient [3]; either may be NULL; untouched unless CLOTH_OK
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT: NULL, n below 2, cell not above 0; CLOTH_ERR_NONFINITE: x,
 *   or x - origin overflows
 * contract: alloc none | cost O(1), 8 loads | threads: any */
CLOTH_API cloth_status cloth_grid_sample(const cloth_grid *grid, const double x[3],
                                         double *distance, double gradient[3]);

/* ===== [2.5] CONTACT ========================================================================= */

typedef enum cloth_initial {                /* pairs that intersect, or touch, at the start    */
    CLOTH_INITIAL_REFUSE = 1,               /* (default) named and refused                     */
    CLOTH_INITIAL_EXEMPT = 2,               /* listed, counted, and free to pass until they part */
    CLOTH_INITIAL_FORCE_INT = 0x7fffffff
} cloth_initial;

/* Whom a part may touch: two things collide when each one's category is in the other's mask. */
typedef struct cloth_collide_part {
    int      self;                          /* collides with itself and with other parts that
                                               do; read only under CLOTH_CONTACT_SELF          */
    uint32_t category, mask;                /* bits                                            */
    double   friction;                      /* its own coefficient; 0: desc.friction; any such
                                               coefficient is at most 1000                     */
} cloth_collide_part;

/* Distances nest: separation t/4 < gap of zones t/2 < range t. Start from
 * cloth_collide_desc_default(). */
typedef struct cloth_collide_desc {
    uint32_t      cookie;
    double        thickness;                /* m, t > 0; default 2e-3. Not the material's      */
    double        stiffness;                /* Pa/m of the proximity potential; 0 (default): a
                                               force of 30 times its weight at t/2, no pole:
                                               its mass at create times 9.81 m/s^2, always     */
    double        relaxation;               /* s, of its damping; default 0.02                 */
    double        friction;                 /* cloth on cloth, default 0.3                     */
    double        slip;                     /* m, give of an anchor before it slips; 1e-5      */
    int           max_passes;               /* of detection and zones, default 40              */
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
                                               surface is that much farther out; at most 5e5
                                               times the thickness of contact                  */
    double              normal[3];          /* PLANE: out of the solid; any length but 0       */
    double              thickness;          /* m, of contact with it; 0 (default): the desc's  */
    double              friction;           /* default 0.3                                     */
    uint32_t            category, mask;     /* default 1 and all                               */
    int                 self_penetrating;   /* MESH, closed, outwards: drags what is in it [8.3] */
    const cloth_grid   *grid;               /* GRID; borrowed, unchanged while the obstacle is
                                               there; its band over radius + thickness         */
} cloth_obstacle_desc;

typedef struct cloth_collide cloth_collide; /* belongs to one sim                              */

typedef struct cloth_obstacle {             /* slot and generation, 0: none                    */
    uint64_t id;
} cloth_obstacle;

typedef struct cloth_hold {                 /* a vertex of cloth held in a pinch         [8.3] */
    int    vertex, slot;                    /* slot: of the obstacle, from 0                   */
    int    face[2];                         /* of the obstacle, between which                  */
    double weight[2][3];                    /* barycentric, of the points there                */
    double share;                           /* of the way from the first to the second; 0 and
                                               one face twice: it is led out of the body       */
} cloth_hold;

typedef struct cloth_collide_report {       /* of the last step                                */
    int    candidates;                      /* pairs that detection looked at                  */
    int    impacts;                         /* pairs that it found                             */
    int    passes, zones, rigid_zones;
    int    rows, largest_zone;              /* rows of the largest zone                        */
    int    qp_iterations;
    int    contacts;                        /* pairs near enough to push                       */
    int    held;                            /* vertices of cloth held in a pinch               */
    int    exempt_faces;                    /* of obstacles, in a pinch                        */
    int    exempt_pairs;                    /* that intersected and have not parted            */
    double push;                            /* m, root mean square of the worst zone           */
    double fraction;                        /* of the step that was taken; 0: none was         */
    double ms_begin, ms_detect, ms_zones;   /* parts of cloth_report.ms.contact                */
} cloth_collide_report;

typedef struct cloth_collide_pair {
    int            faces;                   /* faces a and b, which intersect; else            */
    int            edge_edge, a, b;         /* edges a and b, or vertex a and face b; what is of
                                               an obstacle counts in its mesh (BOX too), 0 of
                                               others. Edges: by lower end, then by the other  */
    cloth_obstacle obstacle;
    int            reversed;                /* vertex or edge a is the obstacle's, b the cloth's */
} cloth_collide_pair;

enum {                                      /* cloth_collide_contact.flags                     */
    CLOTH_CONTACT_SLIDING = 1,              /* friction is at its limit                        */
    CLOTH_CONTACT_ROW     = 2,              /* LEAPFROG: an active row of an impact zone; its
                                               force, impulse over h, is of the last substep   */
    CLOTH_CONTACT_INEXACT = 4,              /* the step ended before Newton converged          */
    CLOTH_CONTACT_HELD    = 8               /* a vertex of it is held in a pinch               */
};

/* A contact pair of the last accepted step, at the end of its last substep. Forces on the first
 * side are force normal + friction, on the second side the opposite. */
typedef struct cloth_collide_contact {
    cloth_collide_pair pair;                /* its features; pair.obstacle 0: cloth on cloth   */
    int            n;                       /* cloth vertices of it, 1 to 4                    */
    int            vertex[4];
    double         weight[4];               /* of each: > 0 on the first side, < 0 on the second */
    double         point[2][3];             /* m, where both sides are nearest                 */
    double         normal[3];               /* towards the first side                          */
    double         gap;                     /* m                                               */
    double         force;                   /* N, along the normal                             */
    double         friction[3];             /* N                                               */
    double         limit;                   /* N, most that friction is                        */
    unsigned       flags;                   /* CLOTH_CONTACT_                                  */
} cloth_collide_contact;

CLOTH_API cloth_collide_desc  cloth_collide_desc_default(void);
CLOTH_API cloth_obstacle_desc cloth_obstacle_desc_default(void);

/* Corners x [8 x 3] of a box: center and half edges m; R [3 x 3] turns it (NULL: not). */
CLOTH_API void cloth_obstacle_box(const double center[3], const double half[3], const double *R,
                                  double *x);

/* Gives a sim its contact; needs desc.contact CLOTH_CONTACT_OBSTACLES or _SELF in its model.
 * in   desc   NULL: the defaults; copied
 * out  *out   owned: cloth_collide_destroy, before the sim or after it and its model: after the
 *             sim, or cloth_sim_set_contact, nothing else may be asked of it
 * returns CLOTH_OK; _UNINIT; _ARGUMENT, _NONFINITE: field and value logged; _UNSUPPORTED: the
 *   model's rung is CLOTH_CONTACT_NONE; _MESH: the cloth intersects or touches itself under
 *   CLOTH_INITIAL_REFUSE (the first pair is logged); _MEMORY */
CLOTH_API cloth_status cloth_collide_create(cloth_sim *sim, const cloth_collide_desc *desc,
                                            cloth_collide **out);
CLOTH_API void         cloth_collide_destroy(cloth_collide *c);             /* NULL allowed    */

/* An obstacle, at rest where desc->x says. Errors as create; _MESH also: a broken mesh. After add
 * and remove the queries know of no last step, and cloth_sim_restore takes only snapshots made
 * with the same obstacles, added alike, in the same slots (the first that is free), else _FORMAT.
 * What sticks to others goes on to stick. On failure, also of the next three, everything is as
 * before; a stale or unknown id: CLOTH_ERR_HANDLE. A grid is read whole once. _UNSUPPORTED: a grid,
 * or self_penetrating, under leapfrog, which has no potential. */
CLOTH_API cloth_status cloth_collide_add(cloth_collide *c, const cloth_obstacle_desc *desc,
                                         cloth_obstacle *id);
CLOTH_API cloth_status cloth_collide_remove(cloth_collide *c, cloth_obstacle id);
/* x_end, shaped as desc->x: reached at the end of the next accepted step, swept on straight paths
 * from the pose of the last accepted state. */
CLOTH_API cloth_status cloth_collide_move(cloth_collide *c, cloth_obstacle id, const double *x_end);
/* The same by a rigid motion of the obstacle as it was added: x_end = R x + p, R [3 x 3] a
 * rotation (NULL: none). Spheres and capsules turn with it. A PLANE and a GRID are moved only:
 * _UNSUPPORTED. */
CLOTH_API cloth_status cloth_collide_pose(cloth_collide *c, cloth_obstacle id, const double R[9],
                                          const double p[3]);
/* From the next step on: coefficient of friction >= 0; motion of the surface beyond its vertices',
 * a conveyor or a drum, v [3] m/s and omega [3] rad/s about the obstacle's first vertex. State. */
CLOTH_API cloth_status cloth_collide_set_friction(cloth_collide *c, cloth_obstacle id,
                                                  double friction);
CLOTH_API cloth_status cloth_collide_set_surface(cloth_collide *c, cloth_obstacle id,
                                                 const double v[3], const double omega[3]);
/* A spring of stiffness k from a point of a face of the cloth to the point `at` of a face of a MESH
 * or BOX, which carries it: a waistband that stays up. The rest is as in cloth_sim_attach, also
 * cloth_sim_detach; the work that the obstacle does is pin work. Goes with the obstacle. */
CLOTH_API cloth_status cloth_collide_attach(cloth_collide *c, cloth_obstacle id, int obstacle_face,
                                            const double at[3], int face, const double bary[3],
                                            double k, cloth_attachment *attachment);
/* There at once; what intersects cloth then is refused or exempt as at create.
 * A sim that sleeps (cloth_step) is woken by move and pose where the box of the way, out by the
 * thickness, meets that of a face of the cloth, or of a plane or a grid; by add, remove, teleport,
 * another friction or surface. Cloth in a pinch does not sleep. Queries and reports answer as when
 * it fell asleep; after a restore or a gradient they know of no contact until it wakes. */
CLOTH_API cloth_status cloth_collide_teleport(cloth_collide *c, cloth_obstacle id, const double *x);

/* cloth_step, and where contact cannot be resolved or Newton stalls a shorter one: h/2, h/4, ..
 * h/2^halvings, pins and obstacles going that part of their way. cloth_collide_last() tells the
 * fraction reached, 0 where it failed. */
CLOTH_API cloth_status cloth_collide_step(cloth_collide *c, double h, int halvings,
                                          cloth_report *report);

/* --- queries, of the last accepted step unless said; after a step that failed, or the call of
 * cloth_grad_backward, they know of none. CLOTH_ERR_ARGUMENT: NULL, max below 0, range not
 * above 0; _NONFINITE: range, x, about; logged --- */

CLOTH_API cloth_collide_report cloth_collide_last(const cloth_collide *c);
/* The first `max` contacts with a force; *count: all of them. */
CLOTH_API cloth_status cloth_collide_contacts(const cloth_collide *c, int max,
                                              cloth_collide_contact *contact, int *count);
/* Force [3] N and torque [3] N m about the point about [3] (NULL: the origin) of the contacts on an
 * obstacle. What holds cloth in pinches is no part of it. */
CLOTH_API cloth_status cloth_collide_wrench(const cloth_collide *c, cloth_obstacle id,
                                            const double about[3], double force[3],
                                            double torque[3]);
/* f [nv x 3] N: all that contact did to each vertex in the last substep, but what holds it in a
 * pinch: E_col and friction as the minimiser felt them, and the impulses of the zones over h. Over
 * a substep of EULER the sum is M (v - v^n)/h less the other forces; of BDF2 it is in balance with
 * its own inertia [8.5]. */
CLOTH_API cloth_status cloth_collide_forces(const cloth_collide *c, double *f);
/* f [nv x 3] N: the part of it that is friction; the rest is along the normals. */
CLOTH_API cloth_status cloth_collide_friction(const cloth_collide *c, double *f);
/* Smallest distance now, m, of pairs nearer than `range`; range when there is none. With a grid it
 * is that of vertices, below 0 inside. */
CLOTH_API cloth_status cloth_collide_gap(cloth_collide *c, double range, double *gap);
/* Pairs of faces that intersect now, exempt ones too: cloth with cloth (SELF), MESH and BOX; others
 * have no faces: see _gap and _exempt. Obstacles' count on from nf, by slot. pairs [max x 2] */
CLOTH_API cloth_status cloth_collide_intersections(cloth_collide *c, int max, int *pairs,
                                                   int *count);
/* The exempt pairs of the accepted state, report.exempt_pairs of them but after a step that failed:
 * of faces that intersect or touch; vertices, edges, faces inside a sphere, a capsule, a plane. */
CLOTH_API cloth_status cloth_collide_exempt(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count);
/* The vertices of cloth that the accepted state holds in pinches, report.held of them likewise. */
CLOTH_API cloth_status cloth_collide_holds(const cloth_collide *c, int max, cloth_hold *hold,
                                           int *count);
/* What could not be resolved in the last step that failed. */
CLOTH_API cloth_status cloth_collide_failed(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count);

typedef struct cloth_untangle_report {
    int    before, after;                   /* pairs that intersect or touch: of faces, or of a
                                               feature with a sphere, a capsule, a plane       */
    int    wandered;                        /* of `after`: faces that intersect and did not    */
    double moved;                           /* m, largest motion of a vertex                   */
    int    tries;                           /* each after the first: half of the motion        */
    int    stalled;                         /* nothing helped: nothing was moved               */
    cloth_collide_pair pair;                /* stalled: the first                              */
} cloth_untangle_report;

/* Pushes pairs that intersect or touch and are exempt (CLOTH_INITIAL_EXEMPT) apart, part of the way
 * a call: call it until report.after is 0, by itself or between steps, which give the cloth its
 * shape back.                                                                              [8.7]
 * Cloth leaves closed obstacles by the nearest point, but a MESH whose faces look inwards, which
 * counts as open; where surfaces cross, the line of intersection is made shorter and what it cuts
 * off smaller; what touches goes 0.4 t to its side, by rounding out of an obstacle's faces.
 *   - only x of vertices that are not pinned changes, v stays; max_move m at most a vertex (0: 5 t)
 *     and what it takes to keep others clear
 *   - pairs that are clear of the tangle stay clear, on their whole path, as in a step. A pair may
 *     be new that is beside one that was, a vertex shared on either side, or had a vertex inside of
 *     the closed obstacle (report.wandered); none elsewhere
 *   - pairs that have parted are exempt no more
 *   - anchors of friction, what pinches hold and BDF2's history are forgotten
 * report may be NULL. returns CLOTH_OK: less tangled, or nothing is left (after 0); CLOTH_ERR_STEP:
 *   no motion that was tried helps, logged with the first pair, all listed by
 *   cloth_collide_failed(); CLOTH_ERR_ARGUMENT, _NONFINITE: max_move or x, logged; _MEMORY;
 *   _CAPACITY; _CANCELLED. The state is as before on failure.
 * contract: alloc scratch | cost: a winding number a vertex and obstacle, detection and zones as of
 *   a step for each try, at most 6; pairs^2 | same bits for any workers */
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
#ifdef CLOTHI_OWN_SQRT
#  pragma push_macro("sqrt")
#  undef sqrt
#  define sqrt clothi_sqrt
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] EXACT SIGNS =====================================================================
 *
 * The sign of a determinant of coordinates, exact. A floating evaluation with an error bound
 * answers nearly always, the rest is worked out without rounding. [Shewchuk 1997, Adaptive
 * precision floating-point arithmetic and fast robust geometric predicates, Discrete &
 * Computational Geometry 18, theorems 6, 7, 10, 18; doi 10.1007/PL00009321]
 *
 *     a + b  =  s + r     s the rounded sum, r what rounding lost, both doubles (two_sum)
 *     a * b  =  p + r     likewise, from halves of 26 bits of a and b (Dekker's product)
 *
 * An expansion is a sum of doubles whose bits do not overlap, smallest first: its sign is that of
 * the last one. It grows by one double after the other: quadratic in the length, never long here.
 * Range: exact for coordinates that are 0 or have 1e-85 < |x| < 1e85. Below, products underflow.
 * Halves are cut by the bits of the number: fused multiply-adds cannot change them.
 *
 * checked: tests/test_exact.c */

static void clothi_two_sum(double a, double b, double *s, double *r) {
    const double sum = a + b, bv = sum - a, av = sum - bv;
    *s = sum;
    *r = (a - av) + (b - bv);
}

/* a = hi + the rest, both of at most 26 bits. */
static double clothi_high_half(double a) {
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
static int clothi_exp_grow(double *e, int n, double b) {
    double q = b, r;
    int    i, m = 0;
    for (i = 0; i < n; i++) {
        clothi_two_sum(q, e[i], &q, &r);
        if (r != 0) e[m++] = r;
    }
    if (q != 0 || m == 0) e[m++] = q;
    return m;
}

/* e [n] += sign a [na] b [nb]; returns the new length, at most n + 2 na nb. */
static int clothi_exp_add(double *e, int n, const double *a, int na, const double *b, int nb,
                          double sign) {
    int i;
    for (i = 0; i < na * nb; i++) {
        double p, r;
        clothi_two_product(a[i / nb], sign * b[i % nb], &p, &r);
        n = clothi_exp_grow(e, n, r);
        n = clothi_exp_grow(e, n, p);
    }
    return n;
}

static int clothi_exp_sign(const double *e, int n) { return (e[n - 1] > 0) - (e[n - 1] < 0); }

/* Sign of (a-c) x (b-c) along an axis: 1 when a, b, c turn counter-clockwise seen from its end, 0
 * when their projection is on one line. In a plane [2] it is axis 2. */
static int clothi_turn_of(const double *a, const double *b, const double *c, int axis) {
    const int    i = (axis + 1) % 3, j = (axis + 2) % 3;
    const double p = (a[i] - c[i]) * (b[j] - c[j]), q = (a[j] - c[j]) * (b[i] - c[i]);
    const double det = p - q, bound = 4.5e-16 * (fabs(p) + fabs(q));  /* 3 roundings of 2^-53 */
    double       ai[2], aj[2], bi[2], bj[2], e[16];
    int          n;
    if (det > bound || -det > bound) return det > 0 ? 1 : -1;
    clothi_two_sum(a[i], -c[i], ai + 1, ai);
    clothi_two_sum(a[j], -c[j], aj + 1, aj);
    clothi_two_sum(b[i], -c[i], bi + 1, bi);
    clothi_two_sum(b[j], -c[j], bj + 1, bj);
    n = clothi_exp_add(e, 0, ai, 2, bj, 2, 1);
    return clothi_exp_sign(e, clothi_exp_add(e, n, aj, 2, bi, 2, -1));
}

/* Sign of (a-d) . (b-d) x (c-d), six times the volume a b c d: 1 when a, b, c turn
 * counter-clockwise seen from the side that d is not on, 0 in one plane; at once when all are at
 * one height, as in a sheet before it falls. */
static int clothi_orient3d(const double *a, const double *b, const double *c, const double *d) {
    const double *const x[3] = {a, b, c};
    double              w[3][3], e[3][3][2], m[16], sum[192], det = 0, bound = 0;
    int                 i, k, n = 0;
    for (k = 0; k < 3; k++)
        if (a[k] == d[k] && b[k] == d[k] && c[k] == d[k]) return 0;
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
        for (k = 0; k < 3; k++) clothi_two_sum(x[i][k], -d[k], e[i][k] + 1, e[i][k]);
    for (i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        int       nm = clothi_exp_add(m, 0, e[1][j], 2, e[2][l], 2, 1);
        nm = clothi_exp_add(m, nm, e[1][l], 2, e[2][j], 2, -1);
        n = clothi_exp_add(sum, n, m, nm, e[0][i], 2, 1);
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

#define CLOTHI_FLAT 1e-6                    /* sin^2 between the sides of a polygon            */

/* Differences of the pair x [4x3] into r [4x3]; returns how many there are: 3 or 4. */
static int clothi_pair_polygon(int edge_edge, const double *x, double *r) {
    clothi_sub3(x, x + (edge_edge ? 6 : 3), r);
    clothi_sub3(x + (edge_edge ? 3 : 0), x + 6, r + 3);
    clothi_sub3(x + (edge_edge ? 3 : 0), x + 9, r + 6);
    clothi_sub3(x, x + 9, r + 9);           /* of a triangle: the last once more */
    return edge_edge ? 4 : 3;
}

/* Sides e [2x3] of the polygon from its first corner, and their cross product. */
static inline void clothi_polygon_plane(const double *r, int n, double *e, double *normal) {
    clothi_sub3(r + 3, r, e);
    clothi_sub3(r + 3 * (n - 1), r, e + 3);
    clothi_cross3(e, e + 3, normal);
}

/* The point v [3] of the polygon r [n x 3] nearest to the origin: v = sum lambda_k r_k. Returns
 * its side, from corner k to k + 1, or -1 inside. Needs |r| < 1e70, exact down to 1e-70. Only sides
 * that have the foot of the perpendicular beyond them can be nearest; of a flat polygon all may. */
static int clothi_nearest(const double *r, int n, double *lambda, double *v) {
    double e[6], normal[3], c[3], p[3], best = HUGE_VAL, at = 0, s, t, nn, d2;
    int    beyond[4] = {0, 0, 0, 0}, i, k, side = 0, flat;
    clothi_polygon_plane(r, n, e, normal);
    nn = clothi_dot3(normal, normal);
    flat = !(nn > CLOTHI_FLAT * clothi_dot3(e, e) * clothi_dot3(e + 3, e + 3) && nn > 1e-250);
    clothi_cross3(e + 3, r, c);
    s = clothi_dot3(c, normal);
    clothi_cross3(r, e, c);
    t = clothi_dot3(c, normal);
    beyond[0] = t < 0, beyond[n - 1] = s < 0;
    beyond[1] = n == 3 ? s + t > nn : s > nn;
    if (n == 4) beyond[2] = t > nn;
    for (i = 0; i < n; i++) {
        const double *a = r + 3 * i, *b = r + 3 * (i + 1 < n ? i + 1 : 0);
        double        side_e[3], ee, ae, part;
        if (!flat && !beyond[i]) continue;
        clothi_sub3(b, a, side_e);
        ee = clothi_dot3(side_e, side_e);
        ae = -clothi_dot3(a, side_e);
        part = !(ae > 0) ? 0 : ae < ee ? ae / ee : 1;
        for (k = 0; k < 3; k++) p[k] = part < 1 ? a[k] + part * side_e[k] : b[k];
        d2 = clothi_dot3(p, p);
        if (!(d2 < best)) continue;
        best = d2, at = part, side = i;
        memcpy(v, p, sizeof p);
    }
    memset(lambda, 0, 4 * sizeof *lambda);
    lambda[side] = 1 - at;
    lambda[side + 1 < n ? side + 1 : 0] = at;
    if (!(nn > 0) || beyond[0] || beyond[1] || beyond[2] || beyond[3]) return side;
    s /= nn, t /= nn;
    for (k = 0; k < 3; k++) p[k] = r[k] + s * e[k] + t * e[3 + k];
    if (!(clothi_dot3(p, p) < best)) return side;
    memcpy(v, p, sizeof p);
    lambda[0] = n == 3 ? 1 - s - t : (1 - s) * (1 - t);
    lambda[1] = n == 3 ? s : s * (1 - t);
    lambda[2] = n == 3 ? t : s * t;
    lambda[3] = n == 3 ? 0 : (1 - s) * t;
    return -1;
}

/* Weights of the four points, of sum 0, from those of the polygon's corners: positive for a vertex
 * and for the first edge, minus the barycentric coordinates for a face, negative for the second
 * edge. */
static void clothi_pair_weights(int edge_edge, const double *lambda, double *w) {
    w[1] = lambda[1] + lambda[2];
    w[0] = edge_edge ? 1 - w[1] : 1;
    w[3] = edge_edge ? -(lambda[2] + lambda[3]) : -lambda[2];
    w[2] = edge_edge ? -1 - w[3] : -lambda[1];
    if (!edge_edge) w[1] = -1 - w[2] - w[3];
}

/* Unit normal of the face v [3] at x; 0 without an area. */
static void clothi_face_normal(const double *x, const int *v, double *n) {
    double size;
    int    k;
    clothi_face_cross(x, v, n);
    size = sqrt(clothi_dot3(n, n));
    for (k = 0; k < 3 && size > 0; k++) n[k] /= size;
}

/* Squared distance m^2 of p from face v [3] of x; b [3]: the nearest point, barycentric. */
static double clothi_face_distance2(const double *x, const int *v, const double *p, double *b) {
    double r[9], lambda[4], d[3] = {0, 0, 0};
    int    i;
    for (i = 0; i < 3; i++) clothi_sub3(p, x + 3 * (size_t)v[i], r + 3 * i);
    (void)clothi_nearest(r, 3, lambda, d);
    memcpy(b, lambda, 3 * sizeof *b);
    return clothi_dot3(d, d);
}

/* The power of two that takes m > 0 to [1/2, 1), as far as doubles go; 1 for 0. */
static double clothi_unit_scale(double m) {
    int e;
    (void)frexp(m, &e);
    return ldexp(1.0, e < -1022 ? 1022 : e > 1022 ? -1022 : -e);
}

/* Distance of a pair x [4x3], m; w [4]: weights of the nearest points, so that sum w_i x_i spans
 * the distance. */
static double clothi_pair_distance(int edge_edge, const double *x, double *w) {
    double       r[12], lambda[4], v[3] = {0, 0, 0};
    const int    n = clothi_pair_polygon(edge_edge, x, r);
    const double m = clothi_max_abs(r, 3 * n);
    const double scale = m > 1e-60 && m < 1e60 ? 1 : clothi_unit_scale(m);
    int          i;
    for (i = 0; i < 3 * n && scale != 1; i++) r[i] *= scale;
    clothi_nearest(r, n, lambda, v);
    clothi_pair_weights(edge_edge, lambda, w);
    return sqrt(clothi_dot3(v, v)) / scale;
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
 *     n(t) = n + x W            the same with a direction that turns with the polygon's plane,
 *                               when the nearest point is inside: n(t).r_k is quadratic, and near
 *                               contact the steps converge as those of Newton's method.
 *
 * Both also hold for polygons of no area and pass beside a polygon. Polynomials are in Bernstein
 * form: the first point of the axis that their convex hull reaches is a safe time. The further of
 * the two counts. Contact is what neither can exclude; for s = 0 it is asked again with twice the
 * digits.
 *
 * Rounding. u = 2^-53, m = the largest |difference|. A corner of r(t) is off by at most 4 u m per
 * axis, a product n.r with |n| = 1 by 13 u m in all: E = 16 u m is kept between s and what counts
 * as free, twice as much where a root of the linear function is taken, and four times as much,
 * times 1 + |W|, for the quadratic. m is brought to about 1 by a power of two when it is beyond
 * 1e-30 .. 1e30.
 *
 * checked: tests/test_ccd.c, tests/fuzz_ccd.c */

#define CLOTHI_CCD_STEPS 256                /* then contact: grazes by less than it can tell    */
#define CLOTHI_CCD_NEAR  (1.0 / 1048576)    /* contact: within s (1 + this)                     */

typedef struct clothi_ccd {
    int    n;                               /* corners                                          */
    double r0[12], r1[12];                  /* [n x 3] at t = 0 and 1                           */
    double s, m, E, scale;
    double floor;                           /* n.r above this is certainly above s              */
} clothi_ccd;

static void clothi_ccd_at(const clothi_ccd *q, double t, double *r) {
    int i;
    for (i = 0; i < 3 * q->n; i++) r[i] = (1 - t) * q->r0[i] + t * q->r1[i];
}

/* Longest certified time from t with the fixed direction n, |n| = 1: t when there is none, 2 when
 * it lasts to the end. */
static double clothi_ccd_axis(const clothi_ccd *q, const double *n, double t) {
    double until = 2;
    int    k;
    for (k = 0; k < q->n; k++) {
        const double h0 = clothi_dot3(n, q->r0 + 3 * k), h1 = clothi_dot3(n, q->r1 + 3 * k);
        if (!((1 - t) * h0 + t * h1 > q->floor)) return t;
        if (!(h1 > q->floor)) until = clothi_min(until, (h0 - q->floor) / (h0 - h1));
    }
    return clothi_max(t, until);
}

/* Where the hull of the quadratic f [3] on [0,1], f[0] > 0, first meets 0; 2: nowhere. */
static double clothi_bernstein_first(const double *f) {
    double first = 2;
    int    i, k;
    for (i = 1; i < 3; i++)
        for (k = 0; !(f[i] > 0) && k < i; k++)
            if (f[k] > 0)
                first = clothi_min(first, (k + (i - k) * (f[k] / (f[k] - f[i]))) / 2);
    return first;
}

/* Longest certified time from t with a direction that turns with the polygon, which is r now:
 * n + x W for x from 0 to 1 between t and the end stays at right angles to the sides e,
 * W.e = -n.(change of e). A corner's distance is quadratic in x; |n + x W| is at most
 * 1 + x^2 W^2/2, as W is at right angles to n but for rounding. Up to x = 1 the hull is too wide,
 * so the first answer bounds the range for the next. */
static double clothi_ccd_turning(const clothi_ccd *q, const double *r, const double *n, double t) {
    double W[3], a[4], b[4], c[4], e[6], to[2] = {0, 0}, across[2][3], normal[3];
    double ww, size, best = 0, h = 1;
    int    i, k, round;
    clothi_polygon_plane(r, q->n, e, normal);
    for (k = 0; k < 3; k++) {
        to[0] += n[k] * (e[k] - (q->r1[3 + k] - q->r1[k]));
        to[1] += n[k] * (e[3 + k] - (q->r1[3 * (q->n - 1) + k] - q->r1[k]));
    }
    clothi_cross3(e + 3, normal, across[0]);
    clothi_cross3(normal, e, across[1]);
    size = clothi_dot3(normal, normal);     /* not 0: n has a direction */
    for (k = 0; k < 3; k++) W[k] = (to[0] * across[0][k] + to[1] * across[1][k]) / size;
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
            first = clothi_min(first, clothi_bernstein_first(f));
        }
        if (i == q->n && first > 1 && h >= 1) return 2;
        if (i == q->n) best = clothi_max(best, h * clothi_min(first, 1));
        h = clothi_min(1, i == q->n ? 4 * best : 1e-3 * h);
    }
    return t + (1 - t) * best;
}

/* Direction out [3], |out| = 1, to the nearest point v of the polygon r on its side, -1 its
 * inside; 0 when there is none. */
static int clothi_ccd_direction(const double *r, int n, int side, const double *v, double *out) {
    double e[6], len;
    int    k;
    if (side < 0) clothi_polygon_plane(r, n, e, out);
    else {
        const double *a = r + 3 * side, *b = r + 3 * (side + 1 < n ? side + 1 : 0);
        double        ee, ve;
        clothi_sub3(b, a, e);
        ee = clothi_dot3(e, e);
        ve = clothi_dot3(v, e);
        memcpy(out, v, 3 * sizeof *v);
        if (clothi_dot3(a, e) < 0 && clothi_dot3(b, e) > 0)     /* at right angles, but for */
            for (k = 0; k < 3; k++) out[k] -= ve / ee * e[k];   /* rounding; a corner's is not */
    }
    len = sqrt(clothi_dot3(out, out));
    if (!(len > 1e-140)) return 0;          /* squares underflow                                */
    if (side < 0 && clothi_dot3(out, r) < 0) len = -len;
    for (k = 0; k < 3; k++) out[k] /= len;
    return 1;
}

/* The whole search in doubles, m in range. */
static int clothi_ccd_run(clothi_ccd *q, double *toi) {
    const double arrived = q->s * (1 + CLOTHI_CCD_NEAR) + 4 * q->E;
    double       t = 0;
    int          step;
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        double r[12], lambda[4], v[3], n[3], next = t, d;
        int    side;
        clothi_ccd_at(q, t, r);
        side = clothi_nearest(r, q->n, lambda, v);
        d = sqrt(clothi_dot3(v, v));
        if (!clothi_ccd_direction(r, q->n, side, v, n)) break;
        next = clothi_ccd_axis(q, n, t);
        if (!(next > 1) && side < 0) next = clothi_max(next, clothi_ccd_turning(q, r, n, t));
        if (next > 1) return 0;
        d = !(next > t) || (d <= arrived && next - t < CLOTHI_CCD_NEAR) ? 0 : d;
        t = next;
        if (d <= 0) break;
    }
    *toi = t;
    return 1;
}

/* ---- twice the digits: for min_sep = 0, where the search above ends in its own rounding. The
 * first of the advances in numbers h + l of 106 bits, from the time reached so far; by the
 * first of the polygon's directions that certifies any. A sum is good
 * to 3 u^2, a product to 7 u^2 [Joldes, Muller, Popescu 2017, Tight and rigorous error bounds for
 * basic building blocks of double-word arithmetic, ACM TOMS 44, doi 10.1145/3121432]: 8 times the
 * counts above with u^2 for u, kept four times over. Steps are fractions of what is left of
 * [0,1], so that doubles do for them. */

typedef struct clothi_dd {
    double h, l;
} clothi_dd;

static clothi_dd clothi_dd_of(double h, double l) {
    clothi_dd c;
    clothi_two_sum(h, l, &c.h, &c.l);
    return c;
}

static clothi_dd clothi_dd_add(clothi_dd a, clothi_dd b) {
    double s, r, v, w;
    clothi_two_sum(a.h, b.h, &s, &r);
    clothi_two_sum(a.l, b.l, &v, &w);
    a = clothi_dd_of(s, r + v);
    return clothi_dd_of(a.h, w + a.l);
}

static clothi_dd clothi_dd_neg(clothi_dd a) {
    const clothi_dd c = {-a.h, -a.l};
    return c;
}

static clothi_dd clothi_dd_sub(clothi_dd a, clothi_dd b) {
    return clothi_dd_add(a, clothi_dd_neg(b));
}

static clothi_dd clothi_dd_mul(clothi_dd a, clothi_dd b) {
    double p, r;
    clothi_two_product(a.h, b.h, &p, &r);
    return clothi_dd_of(p, r + (a.h * b.l + a.l * b.h));
}

static clothi_dd clothi_dd_dot(const clothi_dd *a, const clothi_dd *b) {
    return clothi_dd_add(clothi_dd_add(clothi_dd_mul(a[0], b[0]), clothi_dd_mul(a[1], b[1])),
                         clothi_dd_mul(a[2], b[2]));
}

/* out [n] = a + t (b - a) */
static void clothi_dd_mix(const clothi_dd *a, const clothi_dd *b, clothi_dd t, int n,
                          clothi_dd *out) {
    const clothi_dd s = clothi_dd_sub(clothi_dd_of(1, 0), t);
    int             k;
    for (k = 0; k < n; k++)
        out[k] = clothi_dd_add(clothi_dd_mul(s, a[k]), clothi_dd_mul(t, b[k]));
}

/* Direction out [3] to the plane of the polygon r (side -1), to its side from corner k to k + 1,
 * the foot of the perpendicular or the nearer end; 0 when there is none. */
static int clothi_dd_direction(const clothi_dd *r, int n, int side, clothi_dd *out) {
    const clothi_dd *a = r + 3 * (side < 0 ? 0 : side);
    const clothi_dd *b = r + 3 * (side < 0 ? 1 : side + 1 < n ? side + 1 : 0), *c = r + 3 * (n - 1);
    clothi_dd        e[3];
    double           len;
    int              i, pass;
    for (i = 0; i < 3; i++) e[i] = clothi_dd_sub(b[i], a[i]);
    for (i = 0; i < 3 && side < 0; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = clothi_dd_sub(clothi_dd_mul(e[j], clothi_dd_sub(c[k], a[k])),
                               clothi_dd_mul(e[k], clothi_dd_sub(c[j], a[j])));
    }
    if (side >= 0) memcpy(out, clothi_dd_dot(b, e).h < 0 ? b : a, sizeof e);
    if (side >= 0 && clothi_dd_dot(a, e).h < 0 && clothi_dd_dot(b, e).h > 0)
        for (pass = 0; pass < 3; pass++) {  /* each pass adds 52 bits */
            const clothi_dd dt =
                clothi_dd_of(-clothi_dd_dot(out, e).h / clothi_dd_dot(e, e).h, 0);
            for (i = 0; i < 3; i++) out[i] = clothi_dd_add(out[i], clothi_dd_mul(dt, e[i]));
        }
    len = sqrt(clothi_dd_dot(out, out).h);
    if (!(len > 1e-150)) return 0;
    if (side < 0 && clothi_dd_dot(out, r).h < 0) len = -len;
    for (i = 0; i < 3; i++) out[i] = clothi_dd_mul(out[i], clothi_dd_of(1 / len, 0));
    return 1;
}

/* From `start` on for min_sep = 0: 0 when the rest of the motion is free, else 1 and the time. */
static int clothi_dd_run(int n, const clothi_dd *r0, const clothi_dd *r1, double m, double start,
                         double *toi) {
    const double    E = 1.262177448353619e-29 * m;                 /* 2^-96 */
    const clothi_dd one = clothi_dd_of(1, 0);
    clothi_dd       t = clothi_dd_of(start, 0), r[12], dir[3];
    int             step, side, k;
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        double next = 0;                    /* certified fraction of [t,1]; 2: all of it */
        clothi_dd_mix(r0, r1, t, 3 * n, r);
        for (side = -1; side < n && !(next > 0); side++) {
            double until = 2;
            if (!clothi_dd_direction(r, n, side, dir)) continue;
            for (k = 0; k < n && until > 0; k++) {
                clothi_dd h0 = clothi_dd_dot(dir, r0 + 3 * k), h1 = clothi_dd_dot(dir, r1 + 3 * k);
                clothi_dd_mix(&h0, &h1, t, 1, &h0);
                if (!(h0.h > 2 * E)) until = 0;
                else if (!(h1.h > E)) until = clothi_min(until, (h0.h - E) / (h0.h - h1.h));
            }
            next = until > 1 ? 2 : until * (1 - 1e-15);
        }
        if (next > 1) return 0;
        if (!(next > 1e-31)) break;
        clothi_dd_mix(&t, &one, clothi_dd_of(next, 0), 1, &t);
    }
    /* t is off by rounding over slope: 4e-20 beyond a contact at 4e-7 was seen in 200 000 */
    *toi = clothi_max(start, clothi_min(1, t.h - 1e-15));
    return 1;
}

/* Differences of the pair x [4x3] times a power of two, without error. */
static void clothi_dd_polygon(int edge_edge, const double *x, double scale, clothi_dd *r) {
    static const unsigned char of[2][8] = {{0, 1, 0, 2, 0, 3, 0, 3}, {0, 2, 1, 2, 1, 3, 0, 3}};
    int                        i;
    for (i = 0; i < 12; i++) {
        const unsigned char *p = of[edge_edge] + i / 3 * 2;
        r[i] = clothi_dd_of(x[3 * p[0] + i % 3], -x[3 * p[1] + i % 3]);
        r[i].h *= scale, r[i].l *= scale;
    }
}

/* A contact beyond doubt, which needs no more digits: at t the origin is well inside the polygon,
 * and beside t the volume det(e1, e2, r_0) has both signs, by more than its rounding 2^-45 m e^2, e
 * the largest |side|. With s = 0 it saves 9 us of 10. */
static int clothi_ccd_plain(const clothi_ccd *q, double t) {
    double r[12], lambda[4], v[3], e[6], n[3];
    int    i, signs = 0;
    clothi_ccd_at(q, t, r);
    if (clothi_nearest(r, q->n, lambda, v) >= 0) return 0;
    for (i = 0; i < q->n; i++)
        if (!(lambda[i] > 1e-4)) return 0;
    for (i = -1; i <= 1 && t > CLOTHI_CCD_NEAR && t < 1 - CLOTHI_CCD_NEAR; i += 2) {
        double size, volume;
        clothi_ccd_at(q, t + i * CLOTHI_CCD_NEAR, r);
        clothi_polygon_plane(r, q->n, e, n);
        size = clothi_max_abs(e, 6), volume = clothi_dot3(n, r);
        if (fabs(volume) > 2.9e-14 * q->m * size * size) signs += volume > 0 ? i : -i;
    }
    return abs(signs) == 2;
}

/* The differences, their size and the bounds; 0 when the largest is too large. */
static int clothi_ccd_load(clothi_ccd *q, int edge_edge, const double *xa, const double *xb,
                           double min_sep) {
    int i;
    q->n = clothi_pair_polygon(edge_edge, xa, q->r0);
    clothi_pair_polygon(edge_edge, xb, q->r1);
    q->s = min_sep > 0 ? min_sep : 0;
    q->scale = 1;
    q->m = clothi_max(clothi_max_abs(q->r0, 3 * q->n), clothi_max_abs(q->r1, 3 * q->n));
    if (!(q->m < 1e307)) return 0;
    if (!(q->m > 1e-30 && q->m < 1e30)) {
        q->scale = clothi_unit_scale(q->m);
        q->m *= q->scale;
        q->s *= q->scale;
        for (i = 0; i < 3 * q->n; i++) q->r0[i] *= q->scale, q->r1[i] *= q->scale;
    }
    q->E = 1.7763568394002505e-15 * q->m;   /* 2^-49 */
    q->floor = q->s * (1 + 1e-15) + 2 * q->E;
    return 1;
}

static int clothi_ccd_pair(int edge_edge, const double *xa, const double *xb, double min_sep,
                           double *toi) {
    clothi_ccd q;
    clothi_dd  r0[12], r1[12];
    double     unasked, start;
    if (!toi) toi = &unasked;
    *toi = 0;
    if (clothi_find_nonfinite(xa, 12) >= 0 || clothi_find_nonfinite(xb, 12) >= 0 ||
        !clothi_finite(min_sep))
        return 1;
    if (!clothi_ccd_load(&q, edge_edge, xa, xb, min_sep)) {
        double scaled[24];
        int    i;
        for (i = 0; i < 24; i++)            /* a difference may be beyond the doubles           */
            scaled[i] = (1.0 / 256) * (i < 12 ? xa[i] : xb[i - 12]);
        return clothi_ccd_pair(edge_edge, scaled, scaled + 12, (1.0 / 256) * min_sep, toi);
    }
    *toi = 1;
    if (!clothi_ccd_run(&q, toi)) return 0;
    if (q.s > 0 || clothi_ccd_plain(&q, *toi)) return 1;
    clothi_dd_polygon(edge_edge, xa, q.scale, r0);
    clothi_dd_polygon(edge_edge, xb, q.scale, r1);
    start = *toi, *toi = 1;
    return clothi_dd_run(q.n, r0, r1, q.m, start, toi);
}

CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi) {
    return clothi_ccd_pair(0, xa, xb, min_sep, toi);
}

CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi) {
    return clothi_ccd_pair(1, xa, xb, min_sep, toi);
}

/* Weights w [4] (clothi_pair_weights) and unit normal n [3] of a contact found at toi, such that
 * g = n.sum w_i x_i at xa, which is returned, is positive: the side held at the start. n is the
 * direction of the distance at toi; where that is lost in rounding or has no side at the start
 * that of the distance at the start. 0 is returned when the two touch there; n is then one of
 * these or the x axis. */
static double clothi_contact_frame(int edge_edge, const double *xa, const double *xb, double toi,
                                   double *w, double *n) {
    double     r[12] = {0}, m0, start[3] = {0, 0, 0};
    double     lambda[4] = {1, 0, 0, 0}, v[3] = {0, 0, 0}; /* squares overflow: nothing is near */
    clothi_ccd q;
    int        i, side;
    (void)clothi_ccd_load(&q, edge_edge, xa, xb, 0);
    clothi_ccd_at(&q, toi, r);
    m0 = clothi_max_abs(q.r0, 3 * q.n);
    side = clothi_nearest(r, q.n, lambda, v);
    clothi_pair_weights(edge_edge, lambda, w);
    for (i = 0; i < 3 * q.n; i++) start[i % 3] += lambda[i / 3] * q.r0[i];
    if (clothi_dot3(v, v) > 1e-22 * q.m * q.m && clothi_ccd_direction(r, q.n, side, v, n) &&
        clothi_dot3(n, start) > 1e-12 * m0)
        return clothi_dot3(n, start) / q.scale;
    side = clothi_nearest(q.r0, q.n, lambda, v);
    if (clothi_ccd_direction(q.r0, q.n, side, v, n) && clothi_dot3(n, start) > 0)
        return clothi_dot3(n, start) / q.scale;
    if (!(fabs(clothi_dot3(n, n) - 1) < 1e-9)) n[0] = 1, n[1] = n[2] = 0;
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
 *   build     Each node is sorted along the axis on which the centres of its boxes reach furthest,
 *             by number where these are equal, and split at its median: O(n log^2 n), whatever the
 *             boxes are.
 *   refit     Bottom-up in one sweep; the splits stay, as a mesh that deforms keeps its neighbours.
 *   descent   Of two overlapping nodes both are opened, or the one that is no leaf. Four pairs at
 *             most go on the stack and one comes off it: no more than 3 * 28 + 1 wait. Touching
 *             counts, NaN overlaps everything: the answer is that of brute force.
 *   order     A function looks at each pair of items and puts what comes of it into a list. The
 *             pairs of nodes at level CLOTHI_BVH_TASKS are the tasks of a parallel loop. Each
 *             writes into its own segment of a list, sized by what it found last time; a task
 *             that needs more counts on, then the segments are laid out anew and the loop runs
 *             again. Hence no allocation in the steady state, one order for any number of workers.
 *   features  One face owns each vertex and each edge, and only the owner reports it [CTM08].
 *             Nothing is lost: a box around the owner is around what it owns.
 *
 * [CTM08] Curtis, Tamstorf, Manocha: Fast collision detection for deformable models using
 *         representative-triangles, I3D 2008.
 * checked: tests/test_tree.c */

#define CLOTHI_BVH_LEAF   4
#define CLOTHI_BVH_STACK  88
#define CLOTHI_BVH_TASKS  4                 /* level whose nodes are the tasks, pairwise       */
#define CLOTHI_PAIRS_TASKS (1 << 2 * CLOTHI_BVH_TASKS)

/* A tree over n boxes. memset to 0 before the first build. Item i is reported as first + i. */
typedef struct clothi_bvh {
    int     n, depth;
    int     first;                          /* 0 after build; the caller's to set              */
    int    *item;                           /* [n] items in leaf order                         */
    double *box;                            /* [n x 6] theirs, min xyz, max xyz                */
    double *node;                           /* [2^(depth+1) x 6] from 1                        */
    const double *from;                     /* [n x 6] by item, borrowed: of the last refit    */
} clothi_bvh;

/* Where a task writes: a part of the list. */
typedef struct clothi_segment {
    int   *pair;                            /* [room x 2]                                      */
    size_t begin, room;                     /* in the list                                     */
    size_t found;                           /* pairs that it has, also beyond its room         */
} clothi_segment;

/* A growing list of pairs. memset to 0 before the first use; the memory is kept from one query to
 * the next, so that its size is a high-water mark. */
typedef struct clothi_pairs {
    int            count;
    int           *pair;                    /* [count x 2]                                     */
    clothi_segment task[CLOTHI_PAIRS_TASKS];
} clothi_pairs;

/* --- the list of pairs --- */

static void clothi_pairs_free(const cloth_hooks *hooks, clothi_pairs *p) {
    clothi_free(hooks, p->pair);
    memset(p, 0, sizeof *p);
}

static inline void clothi_segment_put(clothi_segment *s, int a, int b) {
    if (s->found < s->room) s->pair[2 * s->found] = a, s->pair[2 * s->found + 1] = b;
    s->found++;
}

/* --- boxes --- */

/* The boxes [n x 6], min xyz, max xyz, over points moving linearly from xa to xb [n x 3] (NULL: at
 * rest), and `pad` m on every side. Points come within D of each other only if their boxes with
 * pads p, q that add up to D (but for rounding) overlap: from a + p >= b - q follows, rounding
 * being monotone, fl(a + p) >= fl(b - q) */
static void clothi_swept_boxes(int n, const double *xa, const double *xb, double pad, double *box) {
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

/* The boxes [nf x 6] of faces from those of the vertices, vertex_box [nv x 6]. */
static void clothi_face_boxes(int nf, const int *faces, const double *vertex_box, double *box) {
    int f;
    for (f = 0; f < nf; f++, faces += 3, box += 6) {
        clothi_box_join(vertex_box + 6 * faces[0], vertex_box + 6 * faces[1], box);
        clothi_box_join(box, vertex_box + 6 * faces[2], box);
    }
}

/* [6] against [6], touching included; NaN overlaps. */
static inline int clothi_boxes_meet(const double *a, const double *b) {
    return !((a[0] > b[3]) | (b[0] > a[3]) | (a[1] > b[4]) | (b[1] > a[4]) | (a[2] > b[5]) |
             (b[2] > a[5]));
}

/* --- build and refit --- */

/* First item of node j of a level; of node j + 1: the end of node j. */
static inline int clothi_bvh_item(const clothi_bvh *t, int j, int level) {
    return (int)(((uint64_t)(unsigned)j * (unsigned)t->n) >> level);
}

static void clothi_bvh_free(const cloth_hooks *hooks, clothi_bvh *t) {
    clothi_free(hooks, t->node);
    memset(t, 0, sizeof *t);
}

static void clothi_bvh_refit_leaves(int begin, int end, int worker, void *ctx) {
    const clothi_bvh *t = (const clothi_bvh *)ctx;
    int               leaf;
    (void)worker;
    for (leaf = begin; leaf < end; leaf++) {
        const int last = clothi_bvh_item(t, leaf + 1, t->depth);
        double   *node = t->node + 6 * (((size_t)1 << t->depth) + (size_t)leaf);
        int       i = clothi_bvh_item(t, leaf, t->depth), k;
        for (k = 0; k < 6; k++) node[k] = k < 3 ? HUGE_VAL : -HUGE_VAL;
        for (; i < last; i++) {
            const double *from = t->from + 6 * (size_t)t->item[i];
            double       *box = t->box + 6 * (size_t)i;
            for (k = 0; k < 3; k++) {       /* what is no number is everywhere */
                box[k] = from[k] >= -HUGE_VAL ? from[k] : -HUGE_VAL;
                box[3 + k] = from[3 + k] <= HUGE_VAL ? from[3 + k] : HUGE_VAL;
            }
            clothi_box_join(node, box, node);
        }
    }
}

/* Takes other boxes, box [n x 6], for the same items: ~15 ns an item, leaves in parallel. */
static void clothi_bvh_refit(const cloth_hooks *hooks, clothi_bvh *t, const double *box) {
    int i;
    t->from = box;
    clothi_for(hooks, 1 << t->depth, 256, clothi_bvh_refit_leaves, t);
    for (i = (1 << t->depth) - 1; i > 0; i--)
        clothi_box_join(t->node + 12 * (size_t)i, t->node + 12 * (size_t)i + 6,
                        t->node + 6 * (size_t)i);
}

/* A tree over box [n x 6] (min xyz, max xyz), n in [0, CLOTH_MAX_COUNT]; the boxes are copied.
 * *t is owned: clothi_bvh_free; one block, empty on failure.
 * cost O(n log^2 n), ~85 n bytes and scratch */
static cloth_status clothi_bvh_build(const cloth_hooks *hooks, int n, const double *box,
                                     clothi_bvh *t) {
    const size_t m = (size_t)n;
    double      *key = (double *)clothi_alloc(hooks, m, 4 * sizeof *key + sizeof(int));
    size_t       nodes;
    int         *tmp, i, j, k, level;
    memset(t, 0, sizeof *t);
    t->n = n;
    while (n > CLOTHI_BVH_LEAF && ((n - 1) >> t->depth) + 1 > CLOTHI_BVH_LEAF) t->depth++;
    nodes = (size_t)2 << t->depth;
    t->node = (double *)clothi_alloc(hooks, 6 * (nodes + m) * sizeof *t->node +
                                                m * sizeof *t->item, 1);
    if (!key || !t->node) {
        clothi_free(hooks, key);
        clothi_bvh_free(hooks, t);
        return CLOTH_ERR_MEMORY;
    }
    t->box = t->node + 6 * nodes;
    t->item = (int *)(void *)(t->box + 6 * m);
    tmp = (int *)(void *)(key + 4 * m);
    for (i = 0; i < n; i++) {
        for (k = 0; k < 3; k++) {
            const double centre = 0.5 * box[6 * i + k] + 0.5 * box[6 * i + k + 3];
            key[k * n + i] = clothi_finite(centre) ? centre : 0;
        }
        key[3 * n + i] = t->item[i] = i;
    }
    for (level = 0; level <= t->depth; level++)
        for (i = 0; i < 1 << level; i++) {  /* along the widest axis, in a leaf along x */
            int   *item = t->item + clothi_bvh_item(t, i, level), axis = 0;
            int    count = clothi_bvh_item(t, i + 1, level) - clothi_bvh_item(t, i, level);
            double widest = -1;
            for (k = 0; k < 3 && level < t->depth; k++) {
                double lo = HUGE_VAL, hi = -HUGE_VAL;
                for (j = 0; j < count; j++) {
                    lo = clothi_min(lo, key[k * n + item[j]]);
                    hi = clothi_max(hi, key[k * n + item[j]]);
                }
                if (hi - lo > widest) widest = hi - lo, axis = k;
            }
            clothi_sort(item, tmp, count, key + 3 * n);         /* equal ones by number */
            clothi_sort(item, tmp, count, key + axis * n);
        }
    clothi_bvh_refit(hooks, t, box);
    clothi_free(hooks, key);
    return CLOTH_OK;
}

/* The same over the faces [nf x 3] of a mesh at x [nv x 3]. */
static cloth_status clothi_bvh_faces(const cloth_hooks *hooks, int nv, const double *x, int nf,
                                     const int *faces, clothi_bvh *t) {
    double      *box = (double *)clothi_alloc(hooks, 6 * ((size_t)nv + (size_t)nf), sizeof *box);
    cloth_status status;
    memset(t, 0, sizeof *t);
    if (!box) return CLOTH_ERR_MEMORY;
    clothi_swept_boxes(nv, x, NULL, 0, box);
    clothi_face_boxes(nf, faces, box, box + 6 * (size_t)nv);
    status = clothi_bvh_build(hooks, nf, box + 6 * (size_t)nv, t);
    clothi_free(hooks, box);
    return status;
}

/* --- queries --- */

/* The items (first + i) whose boxes overlap box [6], in the tree's order, in O(log n + found):
 *     clothi_bvh_walk w = {tree, box, 1, 0, 0};
 *     while ((item = clothi_bvh_next(&w)) >= 0) ... */
typedef struct clothi_bvh_walk {
    const clothi_bvh *tree;
    const double     *box;                  /* borrowed                                        */
    int               node;                 /* the next one, 0: none                           */
    int               at, end;              /* of the leaf: items still to be looked at        */
} clothi_bvh_walk;

/* The next item, -1 when there is none. */
static int clothi_bvh_next(clothi_bvh_walk *w) {
    const clothi_bvh *t = w->tree;
    for (;;) {
        const int leaf = w->node - (1 << t->depth);
        int       meets;
        while (w->at < w->end)
            if (clothi_boxes_meet(t->box + 6 * (size_t)w->at++, w->box))
                return t->first + t->item[w->at - 1];
        if (!w->node) return -1;
        meets = clothi_boxes_meet(t->node + 6 * (size_t)w->node, w->box);
        if (meets && leaf < 0) {
            w->node *= 2;
            continue;
        }
        if (meets) w->at = clothi_bvh_item(t, leaf, t->depth);
        if (meets) w->end = clothi_bvh_item(t, leaf + 1, t->depth);
        while (w->node & 1) w->node /= 2;   /* up from right children, on to the right one */
        w->node += w->node > 0;
    }
}

/* What a pair of items, which meet, puts into the list. */
typedef void clothi_look_fn(int a, int b, const void *ctx, clothi_segment *out);

typedef struct clothi_bvh_query {
    const clothi_bvh    *a, *b;             /* the same: against itself                        */
    int                  level_a, level_b;  /* of the tasks                                    */
    const unsigned char *sought;            /* [n of a] not 0: only these items; NULL: all     */
    clothi_look_fn      *fn;
    const void          *ctx;
    clothi_pairs        *list;
} clothi_bvh_query;

/* Looks at all item pairs below the nodes na of q->a and nb of q->b, which meet. */
static void clothi_bvh_descend(const clothi_bvh_query *q, int na, int nb, clothi_segment *out) {
    const clothi_bvh *a = q->a, *b = q->b;
    const int leaf_a = 1 << a->depth, leaf_b = 1 << b->depth, self = a == b;
    int       stack[CLOTHI_BVH_STACK][2], n = 0, i, j;
    for (;;) {
        const int open_a = na < leaf_a, open_b = nb < leaf_b, same = self && na == nb;
        if (open_a || open_b) {
            const int i0 = na << open_a, j0 = nb << open_b;
            for (i = i0; i <= i0 + open_a; i++)
                for (j = same ? i : j0; j <= j0 + open_b; j++)
                    if (clothi_boxes_meet(a->node + 6 * (size_t)i, b->node + 6 * (size_t)j))
                        stack[n][0] = i, stack[n++][1] = j;
        } else {
            const int end_a = clothi_bvh_item(a, na - leaf_a + 1, a->depth);
            const int end_b = clothi_bvh_item(b, nb - leaf_b + 1, b->depth);
            const int begin_b = clothi_bvh_item(b, nb - leaf_b, b->depth);
            for (i = clothi_bvh_item(a, na - leaf_a, a->depth); i < end_a; i++)
                for (j = same ? i + 1 : begin_b; j < end_b; j++) {
                    const int f = a->first + a->item[i], g = b->first + b->item[j];
                    if (clothi_boxes_meet(a->box + 6 * (size_t)i, b->box + 6 * (size_t)j))
                        q->fn(self && f > g ? g : f, self && f > g ? f : g, q->ctx, out);
                }
        }
        if (n-- == 0) return;
        na = stack[n][0], nb = stack[n][1];
    }
}

/* Looks at the pairs of items begin .. end - 1 of q->a, a tree from 0 on, that are sought: few, so
 * each by a walk of its own. */
static void clothi_bvh_seek(const clothi_bvh_query *q, int begin, int end, clothi_segment *out) {
    int f, g;
    for (f = begin; f < end; f++) {
        clothi_bvh_walk w = {q->b, q->a->from + 6 * (size_t)f, 1, 0, 0};
        while (q->sought[f] && (g = clothi_bvh_next(&w)) >= 0)
            if (q->a != q->b || f < g) q->fn(f, g, q->ctx, out);
            else if (f > g && !q->sought[g]) q->fn(g, f, q->ctx, out);
    }
}

/* Task i is a pair of nodes; of a self query the second must not be before the first. Of what is
 * sought it is a range of items. */
static void clothi_bvh_query_range(int begin, int end, int worker, void *ctx) {
    const clothi_bvh_query *q = (const clothi_bvh_query *)ctx;
    const int               width = 1 << q->level_b, level = q->level_a + q->level_b;
    int                     task;
    (void)worker;
    for (task = begin; task < end; task++) {
        const int      na = (1 << q->level_a) + task / width, nb = width + task % width;
        clothi_segment out = q->list->task[task];
        out.pair = q->list->pair + 2 * out.begin, out.found = 0;
        if (q->sought)
            clothi_bvh_seek(q, clothi_bvh_item(q->a, task, level),
                            clothi_bvh_item(q->a, task + 1, level), &out);
        else if ((q->a != q->b || nb >= na) &&
                 clothi_boxes_meet(q->a->node + 6 * (size_t)na, q->b->node + 6 * (size_t)nb))
            clothi_bvh_descend(q, na, nb, &out);
        q->list->task[task].found = out.found;
    }
}

/* Looks by fn at every pair (item of a, item of b) whose boxes overlap, touching included, once
 * each; with b the same as a at every pair i < j of its items. sought [n of a] (NULL: all): only at
 * those with an item of a where it is not 0, by the boxes that a was refitted to. What that puts
 * into the list is in an order that the trees alone decide. It is empty on failure:
 * CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY.   cost ~ O(n log n + pairs) for surfaces */
static cloth_status clothi_bvh_look(const cloth_hooks *hooks, const clothi_bvh *a,
                                    const clothi_bvh *b, const unsigned char *sought,
                                    clothi_look_fn *fn, const void *ctx, clothi_pairs *list) {
    const int        la = a->depth < CLOTHI_BVH_TASKS ? a->depth : CLOTHI_BVH_TASKS;
    const int        lb = b->depth < CLOTHI_BVH_TASKS ? b->depth : CLOTHI_BVH_TASKS;
    const int        tasks = 1 << (la + lb);
    clothi_bvh_query query = {a, b, la, lb, sought, fn, ctx, list};
    size_t           all, at = 0;
    int              i, fit;
    list->count = 0;
    do {                                    /* a new list: more room where it was too little */
        for (i = 0, all = 0; i < CLOTHI_PAIRS_TASKS; i++) {
            clothi_segment *s = list->task + i;
            if (!list->pair && s->found >= s->room) s->room = s->found + s->found / 4u + 64u;
            s->begin = all, all += s->room;
        }
        if (!list->pair) list->pair = (int *)clothi_alloc(hooks, all, 2 * sizeof *list->pair);
        if (!list->pair) return CLOTH_ERR_MEMORY;
        clothi_for(hooks, tasks, 1, clothi_bvh_query_range, &query);
        for (fit = 1, i = 0; i < tasks; i++) fit &= list->task[i].found <= list->task[i].room;
        if (!fit) clothi_free(hooks, list->pair), list->pair = NULL;
    } while (!fit);
    for (i = 0; i < tasks; at += list->task[i++].found)     /* one segment behind the other */
        memmove(list->pair + 2 * at, list->pair + 2 * list->task[i].begin,
                2 * list->task[i].found * sizeof(int));
    if (at > (size_t)(0x7fffffff / 2))
        return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "%z pairs are too many", at);
    list->count = (int)at;
    return CLOTH_OK;
}

/* Squared distance m^2 of a point [3] from an item (first + i). */
typedef double clothi_distance_fn(int item, const double *point, const void *ctx);

/* Of a box from p [3]; HUGE_VAL where nothing of it is on the side of p that `side` [3] looks to
 * (NULL: it is). */
static double clothi_node_distance2(const double *box, const double *p, const double *side) {
    double d2 = 0, beyond = 0;
    int    k;
    for (k = 0; k < 3; k++) {
        const double below = box[k] - p[k], above = p[k] - box[3 + k];
        const double d = below > above ? below : above;
        if (d > 0) d2 += d * d;
        if (side) beyond += side[k] > 0 ? -side[k] * above : side[k] * below;
    }
    return !side || beyond > 0 ? d2 : HUGE_VAL;
}

/* The item nearest to a point [3] by fn, if its squared distance is at most *d2; of several the
 * smallest. Returns it and sets *d2; returns -1 and leaves *d2 when there is none. side [3]: only
 * what is on that side of the point (NULL: all), as fn is to know as well. fn must not be less than
 * the distance from the item's box by more than a relative 1e-9. cost O(log n) near by */
static int clothi_bvh_nearest(const clothi_bvh *t, const double *point, const double *side,
                              clothi_distance_fn *fn, const void *ctx, double *d2) {
    const double slack = 1 - 1e-9;
    int          stack[CLOTHI_BVH_STACK], n = 1, best = -1, i;
    double       reach[CLOTHI_BVH_STACK];
    stack[0] = 1, reach[0] = 0;
    while (n) {
        const int node = stack[--n], leaf = node - (1 << t->depth);
        if (reach[n] > *d2) continue;
        if (leaf < 0) {                     /* the nearer child on top */
            const double *box = t->node + 12 * (size_t)node;
            const double  d[2] = {slack * clothi_node_distance2(box, point, side),
                                  slack * clothi_node_distance2(box + 6, point, side)};
            const int     right = d[1] < d[0];
            stack[n] = 2 * node + !right, reach[n++] = d[!right];
            stack[n] = 2 * node + right, reach[n++] = d[right];
            continue;
        }
        for (i = clothi_bvh_item(t, leaf, t->depth); i < clothi_bvh_item(t, leaf + 1, t->depth);
             i++) {
            const int    item = t->first + t->item[i];
            const double d = fn(item, point, ctx);
            if (d < *d2 || (d <= *d2 && (best < 0 || item < best))) *d2 = d, best = item;
        }
    }
    return best;
}

/* --- features --- */

/* Vertices, edges and faces of any set of triangles, also one that is no surface. memset to 0
 * before the first build. A vertex without a face has no owner and is in no pair. */
typedef struct clothi_features {
    int            ne;
    const int     *faces;                   /* [nf x 3] borrowed                               */
    int           *edges;                   /* [ne x 2] a < b; sorted by a, then by b          */
    int           *face_edges;              /* [nf x 3] edge of corners k and k+1              */
    unsigned char *owned;                   /* [nf] bit k: corner k, bit 3+k: edge k is owned  */
} clothi_features;

/* faces [nf x 3] are borrowed as long as *s lives, s->edges is owned: one block; the smallest face
 * owns. *s is empty on failure: CLOTH_ERR_MESH (clothi_check_faces), _MEMORY. cost O(nv + nf) */
static cloth_status clothi_features_build(const cloth_hooks *hooks, int nv, int nf,
                                          const int *faces, clothi_features *s) {
    clothi_edge_sort sort;
    cloth_status     status = clothi_check_counts(hooks, nv, nf);
    int              i, end, h, ne = 0;
    memset(s, 0, sizeof *s);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status == CLOTH_OK) status = clothi_edge_sort_make(hooks, nv, nf, faces, &sort);
    if (status != CLOTH_OK) return status;
    for (i = 0; i < 3 * nf; i = clothi_edge_run(&sort, 3 * nf, i)) ne++;
    s->edges = (int *)clothi_alloc(hooks, (2 * (size_t)ne + 3 * (size_t)nf) * sizeof(int) +
                                              (size_t)nf, 1);
    status = s->edges ? CLOTH_OK : CLOTH_ERR_MEMORY;
    if (status) goto done;
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
    for (h = 0; h < 3 * nf; h++)
        if (!sort.count[faces[h]]++)
            s->owned[h / 3] = (unsigned char)(s->owned[h / 3] | 1 << h % 3);
done:
    clothi_free(hooks, sort.lo);
    return status;
}

typedef struct clothi_features_job {
    const clothi_features *s;
    const double          *box, *face_box;  /* [nv x 6], [nf x 6]                              */
} clothi_features_job;

static inline int clothi_face_has(const int *face, int v) {
    return face[0] == v || face[1] == v || face[2] == v;
}

/* Of faces of two trees, or of one with itself, over clothi_swept_boxes and clothi_face_boxes:
 * pairs v, f of a vertex and a face, and ~p, ~q, below 0, of edges p < q, whose boxes overlap and
 * that share no vertex; of what the faces own: each once. */
static void clothi_features_look(int f, int g, const void *ctx, clothi_segment *out) {
    const clothi_features_job *job = (const clothi_features_job *)ctx;
    const clothi_features     *s = job->s;
    const size_t               at[2] = {3 * (size_t)f, 3 * (size_t)g};
    const int                 *v[2] = {s->faces + at[0], s->faces + at[1]};
    const int                 *e[2] = {s->face_edges + at[0], s->face_edges + at[1]};
    const double              *box[2] = {job->face_box + 2 * at[0], job->face_box + 2 * at[1]};
    const int                  owned[2] = {s->owned[f], s->owned[g]};
    double                     edge[6], other[6];
    int                        i, k, l;
    for (i = 0; i < 2; i++)
        for (k = 0; k < 3; k++) {
            const int p = v[i][k];
            if (owned[i] >> k & 1 && !clothi_face_has(v[1 - i], p) &&
                clothi_boxes_meet(job->box + 6 * (size_t)p, box[1 - i]))
                clothi_segment_put(out, p, i ? f : g);
        }
    for (k = 0; owned[0] >= 8 && owned[1] >= 8 && k < 3; k++) {
        const int a = v[0][k], b = v[0][k == 2 ? 0 : k + 1];
        if (!(owned[0] >> (3 + k) & 1)) continue;
        clothi_box_join(job->box + 6 * (size_t)a, job->box + 6 * (size_t)b, edge);
        if (!clothi_boxes_meet(edge, box[1])) continue;
        for (l = 0; l < 3; l++) {
            const int c = v[1][l], d = v[1][l == 2 ? 0 : l + 1], p = e[0][k], q = e[1][l];
            if (!(owned[1] >> (3 + l) & 1) || a == c || a == d || b == c || b == d) continue;
            clothi_box_join(job->box + 6 * (size_t)c, job->box + 6 * (size_t)d, other);
            if (clothi_boxes_meet(edge, other))
                clothi_segment_put(out, p < q ? ~p : ~q, p < q ? ~q : ~p);
        }
    }
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
 *   that of coordinates, x first, then y, then z. No rounding decides; there is no epsilon. Most
 *   neighbours have a plane between them with room to spare, and need no exact sign.
 * checked: tests/test_intersect.c, against rational arithmetic (tests/exact.h) */

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

/* Closed segments pq and rs; axis: one along which the plane of both keeps its area, -1: not known,
 * they may be anywhere. On one line every turn is 0, along any axis. */
static int clothi_segments_meet(const double *p, const double *q, const double *r,
                                const double *s, int axis) {
    const double *const t[4][3] = {{p, q, r}, {p, q, s}, {r, s, p}, {r, s, q}};
    int                 turn[4], k, touch = 0;
    if (axis < 0 && clothi_orient3d(p, q, r, s)) return 0;
    for (k = 0; k < 4 && axis < 0; k++) axis = clothi_open_axis(t[k][0], t[k][1], t[k][2]);
    for (k = 0; k < 4; k++) {
        turn[k] = clothi_turn_of(t[k][0], t[k][1], t[k][2], axis < 0 ? 0 : axis);
        touch |= !turn[k] && !clothi_beside(t[k][2], t[k][0], t[k][1]);
    }
    return touch || (turn[0] * turn[1] < 0 && turn[2] * turn[3] < 0);
}

/* 1 when the signs do not have both -1 and 1. */
static int clothi_one_sign(int a, int b, int c) {
    return !((a < 0 || b < 0 || c < 0) && (a > 0 || b > 0 || c > 0));
}

/* Segment pq, whose ends have the signs sp and sq against the plane of t, and the closed triangle
 * t: one without an area is its sides. */
static int clothi_edge_meets(const double *p, const double *q, int sp, int sq,
                             const double *const *t) {
    int k, axis;
    if (sp * sq > 0) return 0;
    if (sp || sq)
        return clothi_one_sign(clothi_orient3d(p, q, t[0], t[1]),
                               clothi_orient3d(p, q, t[1], t[2]),
                               clothi_orient3d(p, q, t[2], t[0]));
    axis = clothi_open_axis(t[0], t[1], t[2]);
    if (axis >= 0 && clothi_one_sign(clothi_turn_of(t[0], t[1], p, axis),
                                     clothi_turn_of(t[1], t[2], p, axis),
                                     clothi_turn_of(t[2], t[0], p, axis)))
        return 1;
    for (k = 0; k < 3; k++)
        if (clothi_segments_meet(p, q, t[k], t[(k + 1) % 3], axis)) return 1;
    return 0;
}

/* Signs of the corners of g against the plane of f; 1 when all are on one side. */
static int clothi_plane_signs(const double *const *f, const double *const *g, int *sign) {
    int k;
    for (k = 0; k < 3; k++) sign[k] = clothi_orient3d(f[0], f[1], f[2], g[k]);
    return sign[0] && sign[0] == sign[1] && sign[1] == sign[2];
}

/* Closed triangles without a shared vertex. One without area is its sides, against the other. */
static int clothi_triangles_meet(const double *const *f, const double *const *g) {
    int of_f[3], of_g[3], k;
    if (clothi_plane_signs(f, g, of_g) || clothi_plane_signs(g, f, of_f)) return 0;
    for (k = 0; k < 3; k++) {
        const int l = (k + 1) % 3;
        if (clothi_edge_meets(g[k], g[l], of_g[k], of_g[l], f) ||
            clothi_edge_meets(f[k], f[l], of_f[k], of_f[l], g))
            return 1;
    }
    return 0;
}

/* a and c, neither of them v, in one direction from v. */
static int clothi_one_way(const double *v, const double *a, const double *c) {
    const int order = clothi_point_order(a, v);
    return order && clothi_point_order(c, v) == order && clothi_open_axis(v, a, c) < 0;
}

/* p, not v, in the closed angle c v d, in one plane; without an area it is its two sides. */
static int clothi_in_angle(const double *v, const double *c, const double *d, const double *p) {
    const int axis = clothi_open_axis(v, c, d);
    if (axis < 0) return clothi_one_way(v, c, p) || clothi_one_way(v, d, p);
    return clothi_point_order(p, v) != 0 &&
           clothi_one_sign(clothi_turn_of(v, c, d, axis), clothi_turn_of(v, c, p, axis),
                           clothi_turn_of(v, p, d, axis));
}

/* Triangles f = v a b and g = v c d. Where their planes cross, b A - a B and c D - d C are one
 * direction along the line (A, B: volumes v c d a and v c d b; C, D: v a b c and v a b d): it, or
 * the opposite one, is in both angles. In one plane a side of one is in the other's angle. */
static int clothi_meet_beyond_vertex(const double *const *f, const double *const *g) {
    const double *v = f[0];
    const int     C = clothi_orient3d(v, f[1], f[2], g[1]);
    const int     D = clothi_orient3d(v, f[1], f[2], g[2]);
    int           A, B;
    if (C * D > 0) return 0;
    A = clothi_orient3d(v, g[1], g[2], f[1]);
    B = clothi_orient3d(v, g[1], g[2], f[2]);
    if (A * B > 0) return 0;
    if ((A || B) && (C || D))
        return (A >= 0 && B <= 0 && C <= 0 && D >= 0) || (A <= 0 && B >= 0 && C >= 0 && D <= 0);
    return (!A && clothi_in_angle(v, g[1], g[2], f[1])) ||
           (!B && clothi_in_angle(v, g[1], g[2], f[2])) ||
           (!C && clothi_in_angle(v, f[1], f[2], g[1])) ||
           (!D && clothi_in_angle(v, f[1], f[2], g[2]));
}

/* Triangles u w a and u w b. Without area: segments along the line of the edge, or from u = w. */
static int clothi_meet_beyond_edge(const double *u, const double *w, const double *a,
                                   const double *b) {
    int axis, side;
    if (clothi_orient3d(u, w, a, b)) return 0;
    axis = clothi_open_axis(u, w, a);
    if (axis >= 0) return clothi_turn_of(u, w, a, axis) * clothi_turn_of(u, w, b, axis) > 0;
    if (clothi_open_axis(u, w, b) >= 0 || clothi_open_axis(u, a, b) >= 0) return 0;
    side = clothi_beside(a, u, w);
    return side && clothi_beside(b, u, w) == side;
}

/* 1: a plane through what faces f and g have in common has the rest of both farther than skin m and
 * all rounding from the other. 0: not known. */
static int clothi_faces_parted(const double *x, const int *f, const int *g, double skin) {
    double d[3], e[3] = {0, 0, 0}, r[3], high, low[4] = {HUGE_VAL, HUGE_VAL, HUGE_VAL, HUGE_VAL};
    double size = 0, noise;
    int    i, shared = 0;
    for (i = 0; i < 3; i++) {               /* from the middle of g to that of f, across an edge */
        d[i] = x[3 * f[0] + i] + x[3 * f[1] + i] + x[3 * f[2] + i] - x[3 * g[0] + i] -
               x[3 * g[1] + i] - x[3 * g[2] + i];
        if (clothi_face_has(g, f[i])) clothi_sub3(x + 3 * f[i], e, e), shared++;
    }
    noise = clothi_dot3(d, d);
    high = shared == 2 ? clothi_dot3(d, e) / clothi_dot3(e, e) : 0;
    for (i = 0; i < 3; i++) d[i] -= high * e[i];
    for (i = 0; i < 6; i++) {
        const int v = i < 3 ? f[i] : g[i - 3];
        clothi_sub3(x + 3 * v, x + 3 * f[0], r);
        size = clothi_max(size, clothi_dot3(r, r));
        high = i < 3 ? clothi_dot3(d, r) : -clothi_dot3(d, r);
        low[i / 3] = clothi_min(low[i / 3], high);
        if (!clothi_face_has(i < 3 ? g : f, v)) low[2 + i / 3] = clothi_min(low[2 + i / 3], high);
    }
    high = clothi_min(low[0] + low[3], low[1] + low[2]);
    return high > 0 && high * high > skin * skin * clothi_dot3(d, d) + 1e-28 * noise * size;
}

/* Faces f [3] and g [3], no corner named twice, of finite positions x: 1 when they intersect as
 * the banner says.   cost: none with a plane between them, else 6 signs, up to ~100 in one plane */
static int clothi_faces_intersect(const double *x, const int *f, const int *g) {
    const double *p[3], *q[3];
    int           shared = 0, at_f[3], at_g[3], i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (f[i] == g[j]) at_f[shared] = i, at_g[shared++] = j;
    if (shared == 3 || clothi_faces_parted(x, f, g, 0)) return 0;
    if (shared == 2)
        return clothi_meet_beyond_edge(x + 3 * f[at_f[0]], x + 3 * f[at_f[1]],
                                       x + 3 * f[3 - at_f[0] - at_f[1]],
                                       x + 3 * g[3 - at_g[0] - at_g[1]]);
    for (i = 0; i < 3; i++) {               /* a shared vertex comes first */
        p[i] = x + 3 * f[(i + (shared ? at_f[0] : 0)) % 3];
        q[i] = x + 3 * g[(i + (shared ? at_g[0] : 0)) % 3];
    }
    return shared ? clothi_meet_beyond_vertex(p, q) : clothi_triangles_meet(p, q);
}

typedef struct clothi_surface {             /* all borrowed                                    */
    const double        *x;                 /* [nv x 3] m                                      */
    const int           *faces;             /* [nf x 3]                                        */
    const unsigned char *closed;            /* [nf] 0: face without an inside; NULL: all have  */
    const unsigned char *skip;              /* [nf] not 0: nobody's nearest face; NULL: none   */
    const clothi_bvh    *tree;              /* of the faces' boxes at x; items index faces     */
} clothi_surface;

static void clothi_crossing_look(int a, int b, const void *ctx, clothi_segment *out) {
    const clothi_surface *s = (const clothi_surface *)ctx;
    if (clothi_faces_intersect(s->x, s->faces + 3 * a, s->faces + 3 * b))
        clothi_segment_put(out, a, b);
}

/* The list in increasing order of (first, second), all in [0, n). */
static cloth_status clothi_pairs_sort(const cloth_hooks *hooks, int n, clothi_pairs *p) {
    const size_t m = (size_t)p->count;
    int         *work, *key, *in, *out, *count, i, k;
    if (m < 2) return CLOTH_OK;
    work = (int *)clothi_alloc(hooks, 5 * m + (size_t)n + 1u, sizeof *work);
    if (!work) return CLOTH_ERR_MEMORY;
    key = work + 2 * m, in = key + m, out = in + m, count = out + m;
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
    clothi_bvh           tree;
    clothi_pairs         found;
    const clothi_surface surface = {x, faces, NULL, NULL, &tree};
    cloth_status         status;
    memset(&tree, 0, sizeof tree);
    memset(&found, 0, sizeof found);
    if (count) *count = 0;
    if ((!x && nv > 0) || (!faces && nf > 0) || (!pairs && max_pairs > 0) || max_pairs < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_intersections: %s", max_pairs < 0
                           ? "max_pairs < 0" : !x && nv > 0 ? "x is NULL"
                           : !faces && nf > 0 ? "faces is NULL" : "pairs is NULL");
    status = clothi_check_counts(hooks, nv, nf);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status == CLOTH_OK)
        status = clothi_check_vector(hooks, "cloth_intersections: x", x, 3 * nv);
    if (status == CLOTH_OK) status = clothi_bvh_faces(hooks, nv, x, nf, faces, &tree);
    if (status == CLOTH_OK)                 /* ~0.1 us a candidate */
        status = clothi_bvh_look(hooks, &tree, &tree, NULL, clothi_crossing_look, &surface, &found);
    if (status == CLOTH_OK) status = clothi_pairs_sort(hooks, nf, &found);
    if (status == CLOTH_OK && count) *count = found.count;
    if (found.count < max_pairs) max_pairs = found.count;
    if (status == CLOTH_OK && max_pairs > 0)
        memcpy(pairs, found.pair, 2 * (size_t)max_pairs * sizeof *pairs);
    clothi_pairs_free(hooks, &found);
    clothi_bvh_free(hooks, &tree);
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
 * A projection in the metric of the masses: x0 goes to the nearest allowed point. Strictly convex
 * in x; l is unique where the active rows are independent. A is semidefinite, m x m, sparse: rows
 * couple that share a free unknown.
 *
 *   scale     row i over a power of two near its length: exact. A row without a free unknown is
 *             dropped, or proves infeasibility by itself. Of rows equal but for rounding the
 *             tightest stays.
 *   order     reverse Cuthill-McKee [CM69]: L of any set of rows has a small profile, and its
 *             inner loop is a dot product of two stretches of memory
 *   1 guess   the set F = rows violated at x0 (or with guess > 0)
 *   2 block   solve A_FF l_F = b_F by L L', refined through the slacks w; exchange all rows of the
 *     pivots  wrong sign (l_i < 0 leaves F, w_i < 0 enters) [JP94]; of rows within 60 degrees that
 *             are violated only the worst enters. Again while that leaves fewer wrong rows; about
 *             5 sets for 1000 rows. None wrong: done.
 *   3 finish  dual active set [GI83] from what F is worth (independent rows, l > 0): the most
 *             violated row p enters along the direction d in which all of F stay equations,
 *             l += t d, d = (-A_FF^-1 A_Fp, 1): up to where p holds, or where some l_j = 0 and row
 *             j leaves F. Neither: d is a Farkas certificate. In doubles, and from there, where
 *             these are not believed, in arithmetic of 32 digits [D71]: a few sets more.
 *   settle    the set found, once more in doubles where these are enough; always factored in the
 *             common order: the bits are those of the set
 *
 * Why it ends: 2 stops after a few tries without a smaller number of wrong rows. In 3 each entry
 * raises the dual objective strictly, so no set comes twice, and between two entries rows only
 * leave. Why 3 has twice the digits: rows that stand off each other by the angle e put e^2 into A,
 * so that doubles see 1e-8, where contacts seen twice differ by less. Step 2 is believed only where
 * every row that looks active stands more than 1e-5 off the span of F (the square, `dependent`, is
 * 1e-10). Rows nearer than 1e-13 (COPY) are one row; a ray shorter than that is a contradiction.
 *
 * Farkas: y >= 0 with G_free'y = 0 and y.(h - G_fixed x0) < 0 rules out any x: y.(G x) is both
 * y.(G_fixed x0) and at most y.h. It is checked on the rows as given before it is returned.
 *
 * [GI83] Goldfarb, Idnani, Math. Programming 27 (1983) 1-33. doi:10.1007/BF02591962
 * [JP94] Judice, Pires, Computers Ops Res. 21 (1994) 587-596. doi:10.1016/0305-0548(94)90106-6
 * [CM69] Cuthill, McKee, Proc. 24th ACM Conf. (1969) 157-172. doi:10.1145/800195.805928
 * [D71]  Dekker, Numer. Math. 18 (1971) 224-242. doi:10.1007/BF01397083
 * code   lambda l, w slack, act the set F, at a row's place in L, list its inverse; precise: one
 *        text serves both kinds of numbers, .h alone or .h + .l
 * checked  tests/test_qp.c (closed forms, enumeration, public problems), tests/fuzz_qp.c;
 *          time: tests/bench/bench_qp.c
 */

#define CLOTHI_QP_COOKIE     0x0c107117u
#define CLOTHI_QP_ROUNDING   4.5e-16        /* two roundings                                   */
#define CLOTHI_QP_SMALL      1e-14          /* slack or multiplier, relative: as good as 0     */
#define CLOTHI_QP_COPY       1e-13          /* distance of two rows that are one               */
#define CLOTHI_QP_CANCELLED  1e-24          /* square of the length of a row that is none      */
#define CLOTHI_QP_TINY       1e-290         /* keeps 0/0 away                                  */
#define CLOTHI_QP_PATIENCE   3              /* tries without fewer wrong rows                  */
#define CLOTHI_QP_PARALLEL   0.25           /* cosine squared: rows that stand for each other  */

/* What is as good as 0 in the active set, in doubles and with twice the digits. */
typedef struct clothi_qp_zero {
    double dependent;                       /* square of a row's distance from other rows      */
    double start;                           /* the same, of rows that start the set            */
    double slack;                           /* or direction; relative                          */
    double drift;                           /* rounding of a slack, to the largest multiplier  */
} clothi_qp_zero;

static const clothi_qp_zero clothi_qp_zeros[2] = {{1e-10, 1e-6, 1e-14, 1e-15},
                                                  {1e-26, 1e-18, 1e-19, 1e-28}};

/* ----- memory -------------------------------------------------------------------------------- */

enum { CLOTHI_QP_KNOWN, CLOTHI_QP_A, CLOTHI_QP_L, CLOTHI_QP_BUFFERS };

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
    *out = (cloth_qp_work *)clothi_object(hooks, sizeof **out);
    return *out ? CLOTH_OK : CLOTH_ERR_MEMORY;
}

CLOTH_API void cloth_qp_work_destroy(cloth_qp_work *work) {
    (void)clothi_object_blocks(work, CLOTHI_QP_BUFFERS, 1);
}

CLOTH_API size_t cloth_qp_work_bytes(const cloth_qp_work *work) {
    return clothi_object_blocks(work, CLOTHI_QP_BUFFERS, 0);
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

/* ----- numbers of one or two doubles --------------------------------------------------------- */

/* Row i is divided by 2^exponent[i], so that its length is about 1: nothing is rounded. Everything
 * below speaks of the scaled rows and of their multipliers. */
typedef struct clothi_qp {
    const cloth_qp    *q;
    const cloth_hooks *hooks;               /* log and cancel                                  */
    cloth_qp_work     *work;
    cloth_qp_report   *rep;
    int      m, n, k, most;                 /* rows, unknowns, rows of the factor; sets tried  */
    int      precise;                       /* 1: twice the digits; 0: all .l are 0            */
    const clothi_qp_zero *zero;             /* of these digits                                 */
    double   least;                         /* of the factor; 0: none                          */
    int      wrong;                         /* rows that the set tried has on the wrong side   */
    int     *keep;          /* [m] 1: a row with a free unknown, no copy of another            */
    int     *act;           /* [m] 1: in the set tried                                         */
    int     *at;            /* [m] place in the factor; -1: not in it; -2: it depends on others */
    int     *order;         /* [m] rows by place in the order of small profile                 */
    int     *list, *first;  /* [m] rows of the factor; the first column of each                */
    int     *mark, *exponent;               /* [m]                                             */
    int     *cstart, *crow, *centry;        /* [n+1] entries by column: row, place in g        */
    int     *astart, *acol; /* [m+1] A = G minv G' by rows, both triangles, a_ii first         */
    size_t  *lstart;        /* [m] factor L: row i from column first[i] to i                   */
    double  *g, *h;         /* scaled                                                          */
    double  *size;          /* [m] |h| + sum |g| r, as in the report: the measure of rounding  */
    double  *v;             /* [n] r                                                           */
    double  *a;             /* A                                                               */
    clothi_dd *L;
    clothi_dd *b, *lambda, *w;              /* [m] G x0 - h; multipliers; slack h - G x        */
    clothi_dd *rhs, *ray;                   /* [m]                                             */
    clothi_dd *x, *u;                       /* [n]                                             */
} clothi_qp;

static inline clothi_dd clothi_qp_one(double a) {
    const clothi_dd r = {a, 0};
    return r;
}

/* sum + a b */
static inline clothi_dd clothi_qp_plus(const clothi_qp *s, clothi_dd sum, clothi_dd a,
                                       clothi_dd b) {
    if (s->precise) {
        double p, r, e;
        clothi_two_product(a.h, b.h, &p, &r);
        clothi_two_sum(sum.h, p, &sum.h, &e);
        return clothi_dd_of(sum.h, sum.l + (e + (r + (a.h * b.l + a.l * b.h))));
    }
    sum.h += a.h * b.h;
    return sum;
}

static inline clothi_dd clothi_qp_over(const clothi_qp *s, clothi_dd a, clothi_dd b) {
    const double    q = a.h / b.h;
    const clothi_dd r = clothi_qp_plus(s, a, clothi_qp_one(-q), b);
    return s->precise ? clothi_dd_of(q, r.h / b.h) : clothi_qp_one(q);
}

/* sum - a.b */
static clothi_dd clothi_qp_minus_dot(const clothi_qp *s, clothi_dd sum, const clothi_dd *a,
                                     const clothi_dd *b, int n) {
    double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    int    i;
    if (s->precise) {
        for (i = 0; i < n; i++) sum = clothi_qp_plus(s, sum, clothi_dd_neg(a[i]), b[i]);
        return sum;
    }
    for (i = 0; i + 4 <= n; i += 4) {
        s0 += a[i].h * b[i].h;
        s1 += a[i + 1].h * b[i + 1].h;
        s2 += a[i + 2].h * b[i + 2].h;
        s3 += a[i + 3].h * b[i + 3].h;
    }
    for (; i < n; i++) s0 += a[i].h * b[i].h;
    sum.h -= (s0 + s1) + (s2 + s3);
    return sum;
}

/* ----- the problem, scaled ------------------------------------------------------------------- */

/* Slices of the block whose size is known beforehand. */
static int clothi_qp_layout(clothi_qp *s, size_t nz) {
    const size_t m = (size_t)s->m, n = (size_t)s->n, one = sizeof(int), real = sizeof(double);
    const size_t two = sizeof(clothi_dd), count = 24;
    const clothi_array need[] = {
        {&s->b, m, two}, {&s->lambda, m, two}, {&s->w, m, two}, {&s->rhs, m, two},
        {&s->ray, m, two}, {&s->x, n, two}, {&s->u, n, two}, {&s->g, nz, real}, {&s->h, m, real},
        {&s->size, m, real}, {&s->v, n, real}, {&s->lstart, m, sizeof(size_t)}, {&s->keep, m, one},
        {&s->act, m, one}, {&s->at, m, one}, {&s->order, m, one}, {&s->list, m, one},
        {&s->first, m, one}, {&s->mark, m, one}, {&s->exponent, m, one}, {&s->astart, m + 1, one},
        {&s->cstart, n + 1, one}, {&s->crow, nz, one}, {&s->centry, nz, one}};
    const size_t bytes = clothi_lay(need, count, NULL);
    void *block = bytes ? clothi_qp_take(s->work, CLOTHI_QP_KNOWN, bytes, 1, 0) : NULL;
    return block && clothi_lay(need, count, block);
}

/* Solves of at most m rows, n unknowns and nz entries take no memory any more; 0: there is none. */
static int clothi_qp_reserve(cloth_qp_work *work, int m, int n, size_t nz) {
    const size_t most = (size_t)m * (size_t)m + (size_t)m;
    clothi_qp    s;
    s.work = work, s.m = m, s.n = n;
    return clothi_qp_layout(&s, nz) &&
           clothi_qp_take(work, CLOTHI_QP_A, most, sizeof *s.a + sizeof *s.acol, 0) &&
           clothi_qp_take(work, CLOTHI_QP_L, most / 2 + 1, sizeof *s.L, 0);
}

/* Divides each row by a power of two near its length. */
static cloth_status clothi_qp_scale(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p;
    for (i = 0; i < s->m; i++) {
        double big = 0;
        int    e = 0;
        for (p = q->row[i]; p < q->row[i + 1]; p++)
            big = clothi_max(big, fabs(q->val[p]) * sqrt(q->minv[q->col[p]]));
        if (big > 0 && clothi_finite(big)) (void)frexp(big, &e);
        s->exponent[i] = e;
        s->h[i] = ldexp(q->h[i], -e);
        if (!clothi_finite(big) || abs(e) > 1000 || !clothi_finite(s->h[i]))
            return clothi_fail(s->hooks, CLOTH_ERR_ARGUMENT, "qp row %i: |row| or |h| in units of "
                               "its unknowns is out of range (h = %g)", i, q->h[i]);
        for (p = q->row[i]; p < q->row[i + 1]; p++) s->g[p] = ldexp(q->val[p], -e);
    }
    return CLOTH_OK;
}

/* Does entry p couple its row with others? Both rows of a pair ask: A is symmetric. */
static int clothi_qp_couples(const clothi_qp *s, int p) {
    const double t = s->g[p] * s->q->minv[s->q->col[p]];
    return t < 0 || t > 0;
}

/* Entries by column, those that couple; room for A, in which the rows of each column do. */
static cloth_status clothi_qp_columns(clothi_qp *s) {
    const cloth_qp *q = s->q;
    double          most = 0;
    int             i, p, *start = s->cstart;
    memset(start, 0, ((size_t)s->n + 1) * sizeof *start);
    for (p = 0; p < q->row[s->m]; p++) start[q->col[p]] += clothi_qp_couples(s, p);
    for (i = 0; i < s->n; i++) start[i + 1] += start[i];
    for (i = s->m - 1; i >= 0; i--)         /* as in clothi_sort_by                            */
        for (p = q->row[i + 1] - 1; p >= q->row[i]; p--)
            if (clothi_qp_couples(s, p)) {
                const int to = --start[q->col[p]];
                s->crow[to] = i;
                s->centry[to] = p;
            }
    for (i = 0; i < s->n; i++) {
        const double len = start[i + 1] - start[i];
        most += len * len;
    }
    most = clothi_min(most, (double)s->m * s->m) + s->m;
    if (most > 2147483647.0)
        return clothi_fail(s->hooks, CLOTH_ERR_CAPACITY, "qp.m = %i: its rows share so many "
                           "unknowns that %g pairs of rows couple", s->m, most);
    s->a = (double *)clothi_qp_take(s->work, CLOTHI_QP_A, (size_t)most,
                                    sizeof *s->a + sizeof *s->acol, 0);
    if (!s->a) return CLOTH_ERR_MEMORY;
    s->acol = (int *)(void *)(s->a + (size_t)most);
    return CLOTH_OK;
}

/* A = G minv G'. */
static void clothi_qp_matrix(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p, f, nz = 0;
    for (i = 0; i < s->m; i++) s->mark[i] = -1;
    for (i = 0; i < s->m; i++) {
        const int begin = s->astart[i] = nz;
        s->mark[i] = nz;
        s->acol[nz] = i;
        s->a[nz++] = 0;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int    c = q->col[p];
            const double t = s->g[p] * q->minv[c];
            if (!clothi_qp_couples(s, p)) continue;
            for (f = s->cstart[c]; f < s->cstart[c + 1]; f++) {
                const int j = s->crow[f];
                if (s->mark[j] < begin) {
                    s->mark[j] = nz;
                    s->acol[nz] = j;
                    s->a[nz++] = 0;
                }
                s->a[s->mark[j]] += t * s->g[s->centry[f]];
            }
        }
    }
    s->astart[s->m] = nz;
}

static double clothi_qp_diagonal(const clothi_qp *s, int i) { return s->a[s->astart[i]]; }

/* u = G' lambda, v = minv |G'| lambda. */
static void clothi_qp_pull(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p;
    memset(s->u, 0, (size_t)s->n * sizeof *s->u);
    memset(s->v, 0, (size_t)s->n * sizeof *s->v);
    for (i = 0; i < s->m; i++) {
        const clothi_dd l = s->lambda[i];
        if (!(l.h < 0 || l.h > 0)) continue;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int c = q->col[p];
            s->u[c] = clothi_qp_plus(s, s->u[c], clothi_qp_one(s->g[p]), l);
            s->v[c] += fabs(l.h * s->g[p]);
        }
    }
    for (i = 0; i < s->n; i++) s->v[i] *= q->minv[i];
}

/* Slack w = h - G x of all rows, and what its rounding is measured by: the sizes of the numbers
 * that each x was made of, at most the largest |x| or |x0|. */
static void clothi_qp_slack(clothi_qp *s) {
    const cloth_qp *q = s->q;
    double          big = 0;
    int             i, p;
    for (i = 0; i < s->n; i++) big = clothi_max(big, clothi_max(fabs(s->x[i].h), fabs(q->x0[i])));
    for (i = 0; i < s->n; i++)
        s->v[i] = clothi_max(clothi_min(s->v[i], big),
                             clothi_max(fabs(s->x[i].h), fabs(q->x0[i])));
    for (i = 0; i < s->m; i++) {
        clothi_dd sum = clothi_qp_one(s->h[i]);
        double    size = fabs(sum.h) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int c = q->col[p];
            sum = clothi_qp_plus(s, sum, clothi_qp_one(-s->g[p]), s->x[c]);
            size += fabs(s->g[p]) * s->v[c];
        }
        s->w[i] = sum;
        s->size[i] = size;
    }
}

/* x = x0 - minv G' lambda and its slacks. */
static void clothi_qp_point(clothi_qp *s) {
    int i;
    clothi_qp_pull(s);
    for (i = 0; i < s->n; i++)
        s->x[i] = clothi_qp_plus(s, clothi_qp_one(s->q->x0[i]), clothi_qp_one(-s->q->minv[i]),
                                 s->u[i]);
    clothi_qp_slack(s);
}

/* b with as many digits as asked; x is x0, w its slack. */
static void clothi_qp_digits(clothi_qp *s, int precise) {
    int i;
    s->precise = precise, s->zero = clothi_qp_zeros + precise;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    clothi_qp_point(s);
    for (i = 0; i < s->m; i++) s->b[i] = clothi_dd_neg(s->w[i]);
}

/* Of rows that are positive multiples of each other but for rounding, the tightest stays. u is 0,
 * and is again. */
static void clothi_qp_drop_copies(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, e, p, pass;
    for (i = 0; i < s->m; i++)
        for (e = s->astart[i] + 1; e < s->astart[i + 1] && s->keep[i]; e++) {
            const int    j = s->acol[e];
            const double a = s->a[e], aj = clothi_qp_diagonal(s, j), t = a / aj;
            const double ai = clothi_qp_diagonal(s, i);
            double       apart = 0;         /* square of the distance of row i from t row j */
            if (j > i || !s->keep[j] || !(a > 0) || a * a < (1 - 1e-6) * ai * aj) continue;
            for (pass = 0; pass < 4; pass++) {      /* i in, j out, both up */
                const int r = pass & 1 ? j : i;
                for (p = q->row[r]; p < q->row[r + 1]; p++) {
                    double *u = &s->u[q->col[p]].h;
                    if (pass < 2) *u += pass ? -t * s->g[p] : s->g[p];
                    else apart += *u * *u * q->minv[q->col[p]], *u = 0;
                }
            }
            if (apart > CLOTHI_QP_COPY * CLOTHI_QP_COPY * ai) continue;
            s->keep[s->b[i].h > t * s->b[j].h ? j : i] = 0;
            s->rep->dropped++;
        }
}

/* Reverse Cuthill-McKee [CM69]: breadth first over the rows that couple, from the first of each
 * component, into order from its end on; a root at the component's end makes the profile no smaller
 * here. */
static void clothi_qp_order(clothi_qp *s) {
    int i, e, head = s->m, end = s->m;
    for (i = 0; i < s->m; i++) s->mark[i] = !s->keep[i];
    for (i = 0; i < s->m; i++) {
        if (s->mark[i]) continue;
        s->mark[i] = 1;
        for (s->order[--end] = i; head > end;) {
            const int r = s->order[--head];
            for (e = s->astart[r]; e < s->astart[r + 1]; e++)
                if (!s->mark[s->acol[e]]) {
                    s->mark[s->acol[e]] = 1;
                    s->order[--end] = s->acol[e];
                }
        }
    }
    for (i = 0; i < s->m; i++)
        if (!s->keep[i]) s->order[--end] = i;
}

/* ----- the factor ---------------------------------------------------------------------------- */

/* y [k], 0 before `low`, becomes L^-1 y. */
static void clothi_qp_forward(const clothi_qp *s, clothi_dd *y, int low) {
    int i;
    for (i = low; i < s->k; i++) {
        const int        from = s->first[i] > low ? s->first[i] : low;
        const clothi_dd *row = s->L + s->lstart[i] + (from - s->first[i]);
        y[i] = clothi_qp_over(s, clothi_qp_minus_dot(s, y[i], row, y + from, i - from),
                              row[i - from]);
    }
}

/* y = L^-1 (column r of A), from its first entry on, *low; returns what is left of a_rr. For twice
 * the digits the column is made anew: most are never asked for. */
static clothi_dd clothi_qp_reduce(const clothi_qp *s, int r, clothi_dd *y, int *low) {
    const cloth_qp *q = s->q;
    const int       k = s->k;
    clothi_dd       own = clothi_qp_one(s->precise ? 0 : clothi_qp_diagonal(s, r));
    int             e, f, p;
    for (*low = k, e = s->astart[r]; e < s->astart[r + 1]; e++) {
        const int at = s->at[s->acol[e]];
        if (at >= 0 && at < *low) *low = at;
    }
    memset(y + *low, 0, (size_t)(k - *low) * sizeof *y);
    for (e = s->astart[r]; e < s->astart[r + 1] && !s->precise; e++)
        if (s->at[s->acol[e]] >= 0) y[s->at[s->acol[e]]].h = s->a[e];
    for (p = q->row[r]; p < q->row[r + 1] && s->precise; p++) {
        const int       c = q->col[p];
        const clothi_dd t = clothi_qp_plus(s, clothi_qp_one(0), clothi_qp_one(s->g[p]),
                                           clothi_qp_one(q->minv[c]));
        for (f = s->cstart[c]; f < s->cstart[c + 1] && clothi_qp_couples(s, p); f++) {
            const int  at = s->at[s->crow[f]];
            clothi_dd *to = s->crow[f] == r ? &own : at >= 0 ? y + at : NULL;
            if (to) *to = clothi_qp_plus(s, *to, t, clothi_qp_one(s->g[s->centry[f]]));
        }
    }
    clothi_qp_forward(s, y, *low);
    return clothi_qp_minus_dot(s, own, y + *low, y + *low, k - *low);
}

/* Factors the rows with act in order, but those the square of whose distance from the others is at
 * most `least` of their length: at = -2. Before the first row that comes or goes L stays. 0: no
 * memory. */
static int clothi_qp_factor(clothi_qp *s, double least) {
    const int same = s->least >= least && s->least <= least;
    size_t    used = 0, more;
    int       p, from, low;
    for (from = 0; from < s->m && same; from++)
        if (!s->act[s->order[from]] != (s->at[s->order[from]] == -1)) break;
    for (s->k = 0, p = from; p < s->m; p++) s->at[s->order[p]] = -1;
    for (p = 0; p < from; p++) s->k += s->at[s->order[p]] >= 0;
    if (s->k) used = s->lstart[s->k - 1] + (size_t)(s->k - s->first[s->k - 1]);
    s->least = least;
    s->rep->factorizations++;
    for (p = from; p < s->m; p++) {
        const int r = s->order[p];
        clothi_dd pivot, root;
        if (!s->act[r]) continue;
        pivot = clothi_qp_reduce(s, r, s->rhs, &low);
        if (!(pivot.h > least * clothi_qp_diagonal(s, r))) {
            s->at[r] = -2;
            continue;
        }
        more = (size_t)(s->k - low);
        s->L = (clothi_dd *)clothi_qp_take(s->work, CLOTHI_QP_L, used + more + 1, sizeof *s->L,
                                           used * sizeof *s->L);
        if (!s->L) return 0;
        memcpy(s->L + used, s->rhs + low, more * sizeof *s->L);
        root = clothi_qp_one(sqrt(pivot.h));
        pivot = clothi_qp_plus(s, pivot, clothi_dd_neg(root), root);
        s->L[used + more] = s->precise ? clothi_dd_of(root.h, 0.5 * pivot.h / root.h) : root;
        s->first[s->k] = low;
        s->list[s->k] = r;
        s->lstart[s->k] = used;
        s->at[r] = s->k++;
        used += more + 1;
    }
    return 1;
}

/* y [k] becomes L'^-1 y. */
static void clothi_qp_back(const clothi_qp *s, clothi_dd *y) {
    int i, j;
    for (i = s->k - 1; i >= 0; i--) {
        const clothi_dd *row = s->L + s->lstart[i];
        const int        f = s->first[i];
        const clothi_dd  t = clothi_dd_neg(y[i] = clothi_qp_over(s, y[i], row[i - f]));
        for (j = f; j < i; j++) y[j] = clothi_qp_plus(s, y[j], t, row[j - f]);
    }
}

/* Solves the equations of the factored rows; refines until their slacks are rounding. */
static int clothi_qp_equations(clothi_qp *s) {
    const int passes = s->precise ? 1 : 6;
    double    before = CLOTHI_HUGE;
    int       i, pass;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    for (i = 0; i < s->k; i++) s->rhs[i] = s->b[s->list[i]];
    for (pass = 0; pass < passes; pass++) {
        double worst = 0;
        clothi_qp_forward(s, s->rhs, 0);
        clothi_qp_back(s, s->rhs);
        for (i = 0; i < s->k; i++) {
            clothi_dd *l = s->lambda + s->list[i];
            *l = clothi_qp_plus(s, *l, clothi_qp_one(1), s->rhs[i]);
        }
        clothi_qp_point(s);
        for (i = 0; i < s->k; i++) {
            const int r = s->list[i];
            s->rhs[i] = clothi_dd_neg(s->w[r]);
            worst = clothi_max(worst, fabs(s->w[r].h) / s->size[r]);
        }
        if (!(worst < before)) return worst <= CLOTHI_QP_SMALL;
        if (worst <= CLOTHI_QP_ROUNDING) return 1;
        before = 0.5 * worst;
    }
    return before <= 0.5 * CLOTHI_QP_SMALL;
}

/* Multipliers that are 0 but for rounding become 0. */
static void clothi_qp_clamp(clothi_qp *s) {
    int i;
    for (i = 0; i < s->m; i++)
        if (s->lambda[i].h < 0) s->lambda[i] = clothi_qp_one(0);
    clothi_qp_point(s);
}

/* ----- block pivoting ------------------------------------------------------------------------ */

/* Is a row that points much the same way violated more? */
static int clothi_qp_shadowed(const clothi_qp *s, int i) {
    const clothi_dd *w = s->w;
    const double     mine = w[i].h * fabs(w[i].h) / clothi_qp_diagonal(s, i);
    int              e;
    for (e = s->astart[i] + 1; e < s->astart[i + 1]; e++) {
        const int    j = s->acol[e];
        const double a = s->a[e], aj = clothi_qp_diagonal(s, j);
        double       other;
        if (!(a > 0) || !s->keep[j] || !(w[j].h < 0)) continue;
        if (a * a < CLOTHI_QP_PARALLEL * clothi_qp_diagonal(s, i) * aj) continue;
        other = w[j].h * fabs(w[j].h) / aj;
        if (other < mine || (j < i && !(other > mine))) return 1;
    }
    return 0;
}

/* Solves with act as equations. s->wrong: rows on the wrong side of complementarity, which get a
 * mark; 0: the optimum is in x and lambda; -1: none, but doubles cannot tell: a row outside the
 * factor that looks active must stand well off the span of the factored rows, or it decides where x
 * lies by less than its slack is known to. */
static cloth_status clothi_qp_try(clothi_qp *s) {
    double big = 0;
    int    i, exact, low;
    if (!clothi_qp_factor(s, s->zero->dependent)) return CLOTH_ERR_MEMORY;
    exact = clothi_qp_equations(s);
    for (i = 0; i < s->m; i++) big = clothi_max(big, fabs(s->lambda[i].h));
    for (i = 0, s->wrong = 0; i < s->m; i++) {
        s->mark[i] = s->at[i] >= 0 ? s->lambda[i].h < -CLOTHI_QP_SMALL * big
                                   : s->keep[i] && s->at[i] == -1 &&
                                     s->w[i].h < -CLOTHI_QP_SMALL * s->size[i];
        s->wrong += s->mark[i];
    }
    if (s->wrong) return CLOTH_OK;
    for (i = 0; i < s->m && exact; i++)
        if (s->keep[i] && s->at[i] < 0 && !(s->w[i].h > CLOTHI_QP_SMALL * s->size[i]))
            exact = s->at[i] != -2 && clothi_qp_reduce(s, i, s->rhs, &low).h >
                                          s->zero->dependent * clothi_qp_diagonal(s, i);
    if (exact) clothi_qp_clamp(s);
    else s->wrong = -1;
    return CLOTH_OK;
}

/* Exchanges all rows on the wrong side at once as long as that lowers their number, or has done so
 * within the last few tries. s->wrong 0: the optimum is in x and lambda; else act is where to go
 * on. */
static cloth_status clothi_qp_pivot(clothi_qp *s) {
    int best = s->m + 1, patience = CLOTHI_QP_PATIENCE, i;
    for (s->wrong = 1; s->rep->iterations < s->most;) {
        cloth_status status = clothi_cancelled(s->hooks, NULL);
        s->rep->iterations++;
        if (!status) status = clothi_qp_try(s);
        if (status || s->wrong <= 0) return status;
        patience = s->wrong < best ? CLOTHI_QP_PATIENCE : patience - 1;
        if (s->wrong < best) best = s->wrong;
        if (patience < 0) break;
        for (i = 0; i < s->m; i++)
            if (s->mark[i]) s->act[i] = s->at[i] < 0 && !clothi_qp_shadowed(s, i);
    }
    return CLOTH_OK;
}

/* ----- the dual active set ------------------------------------------------------------------- */

/* The rows with act, thinned until they are independent and their multipliers not negative. */
static int clothi_qp_thin(clothi_qp *s) {
    int i, again = 1;
    while (again) {
        if (!clothi_qp_factor(s, s->zero->start)) return 0;
        clothi_qp_equations(s);
        for (i = 0, again = 0; i < s->m; i++) {
            again |= s->lambda[i].h < 0;
            s->act[i] = s->at[i] >= 0 && !(s->lambda[i].h < 0);
        }
    }
    return 1;
}

/* The row that is violated most, -1: none. mark[i] == -3: its violation is rounding of the rows
 * that it depends on. */
static int clothi_qp_worst(const clothi_qp *s) {
    double most = 0, big = 0;
    int    i, worst = -1;
    for (i = 0; i < s->m; i++) big = clothi_max(big, s->lambda[i].h);
    for (i = 0; i < s->m; i++) {
        const double v = -s->w[i].h, length = sqrt(clothi_qp_diagonal(s, i));
        if (!s->keep[i] || s->at[i] >= 0 || s->mark[i] == -3) continue;
        if (!(v > s->zero->slack * s->size[i] + s->zero->drift * big)) continue;
        if (v > most * length) most = v / length, worst = i;
    }
    return worst;
}

/* Brings row p in: along the direction in which the factored rows stay equations, lambda_p grows
 * until p holds, or until a multiplier is 0 and its row leaves. CLOTH_OK; *endless: no end to it,
 * ray (factored rows) and 1 for p are the certificate. */
static cloth_status clothi_qp_bring(clothi_qp *s, int p, int *endless) {
    const double least = s->zero->dependent * clothi_qp_diagonal(s, p);
    clothi_dd   *ray = s->ray, v = clothi_dd_neg(s->w[p]);
    int          moved = 0;
    for (*endless = 0;;) {
        clothi_dd pivot, t = clothi_qp_one(CLOTHI_HUGE);
        double    big = clothi_qp_diagonal(s, p);   /* a_ii y_i^2: what G'y is measured by */
        int       i, low, leave = -1;
        s->at[p] = -1;
        pivot = clothi_qp_reduce(s, p, ray, &low);
        memset(ray, 0, (size_t)low * sizeof *ray);
        clothi_qp_back(s, ray);
        if (pivot.h > least) t = clothi_qp_over(s, v, pivot);
        else if (v.h <= CLOTHI_QP_COPY * s->size[p] && !moved) {
            s->mark[p] = -3;
            return CLOTH_OK;
        }
        for (i = 0; i < s->k; i++) {
            const int r = s->list[i];
            clothi_dd q;
            big = clothi_max(big, ray[i].h * ray[i].h * clothi_qp_diagonal(s, r));
            if (!(ray[i].h > s->zero->slack)) continue;
            q = clothi_qp_over(s, s->lambda[r], ray[i]);
            if (q.h < t.h) t = q, leave = i;
        }
        *endless = leave < 0 && !(pivot.h > s->zero->dependent * big);
        if (*endless) return CLOTH_OK;
        t = clothi_dd_neg(t);
        for (i = 0; i < s->k; i++) {
            clothi_dd *l = s->lambda + s->list[i];
            *l = clothi_qp_plus(s, *l, t, ray[i]);
            if (l->h < 0 || i == leave) *l = clothi_qp_one(0);
        }
        moved |= t.h < 0;
        if (pivot.h > least) v = clothi_qp_plus(s, v, t, pivot);
        if (leave < 0) break;
        s->act[s->list[leave]] = 0;
        if (!clothi_qp_factor(s, s->zero->dependent)) return CLOTH_ERR_MEMORY;
    }
    s->act[p] = 1;
    if (!clothi_qp_factor(s, s->zero->dependent)) return CLOTH_ERR_MEMORY;
    clothi_qp_equations(s);                 /* anew: no drift over the steps */
    clothi_qp_clamp(s);
    return CLOTH_OK;
}

/* Are the multipliers in lambda, of the rows as given, a proof that no x satisfies them? Then, the
 * largest made 1, they are the answer. */
static int clothi_qp_prove(clothi_qp *s) {
    const cloth_qp *q = s->q;
    double         *u = s->v, most = 0, big = 0, sum = 0, size = 0, off = 0;
    int             i, p;
    memset(u, 0, (size_t)s->n * sizeof *u);
    for (i = 0; i < s->m; i++) most = clothi_max(most, s->lambda[i].h);
    for (i = 0; i < s->m && most > 0; i++) {
        const double y = s->lambda[i].h / most;
        sum += y * q->h[i];
        size += y * fabs(q->h[i]);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int    c = q->col[p];
            const double f = q->val[p] * y, t = f * q->x0[c];
            if (y > 0) big = clothi_max(big, fabs(q->val[p]));
            if (q->minv[c] > 0) u[c] += f;
            else sum -= t, size += fabs(t);
        }
    }
    for (i = 0; i < s->n; i++) off = clothi_max(off, fabs(u[i]));
    if (!(off <= 1e-10 * big && sum < -CLOTHI_QP_SMALL * size)) return 0;
    for (i = 0; i < s->m; i++) s->lambda[i].h /= most;
    for (i = 0; i < s->n; i++) s->x[i].h = q->x0[i];
    s->rep->primal = s->rep->dual = s->rep->complementarity = s->rep->residual = 0;
    s->rep->objective = 0, s->rep->active = 0, s->rep->certificate = sum;
    s->rep->outcome = CLOTH_QP_INFEASIBLE;
    return 1;
}

/* Goldfarb and Idnani's method from the rows with act, half of the tries at most in doubles. The
 * set found is settled in doubles where these are enough: so it would have ended, had block
 * pivoting found it. */
static cloth_status clothi_qp_active_set(clothi_qp *s, int precise) {
    const size_t bytes = (size_t)s->m * sizeof *s->ray;
    const int    most = precise ? s->most : s->most / 2;
    cloth_status status;
    int          i, p, ray;
    s->rep->precise = precise;
    clothi_qp_digits(s, precise);
    if (!clothi_qp_thin(s)) return CLOTH_ERR_MEMORY;
    for (i = 0; i < s->m; i++) s->mark[i] = 0;
    while ((p = clothi_qp_worst(s)) >= 0 && s->rep->iterations < most) {
        s->rep->iterations++;
        status = clothi_cancelled(s->hooks, NULL);
        if (!status) status = clothi_qp_bring(s, p, &ray);
        if (status) return status;
        if (!ray) continue;
        memset(s->lambda, 0, bytes);
        s->lambda[p].h = 1;
        for (i = 0; i < s->k; i++)
            if (s->ray[i].h < 0)
                s->lambda[s->list[i]].h =
                    ldexp(-s->ray[i].h, s->exponent[p] - s->exponent[s->list[i]]);
        if (clothi_qp_prove(s)) return CLOTH_OK;
        /* violated by no more than the rounding of rows that almost contradict it: left out; what
         * that does to the solution, the residual tells */
        s->mark[p] = -3;
        if (!clothi_qp_thin(s)) return CLOTH_ERR_MEMORY;
    }
    s->rep->outcome = p < 0 ? CLOTH_QP_SOLVED : CLOTH_QP_MAX_ITERATIONS;
    memcpy(s->ray, s->lambda, bytes);
    for (i = 0; i < s->m; i++) s->act[i] = s->lambda[i].h > 0;
    clothi_qp_digits(s, 0);
    status = clothi_qp_try(s);
    if (status || s->wrong == 0) return status;
    memcpy(s->lambda, s->ray, bytes);
    s->precise = precise;
    clothi_qp_point(s);
    return CLOTH_OK;
}

/* ----- the call ------------------------------------------------------------------------------ */

/* Multipliers of the rows as given; residuals of x and lambda as returned. */
static void clothi_qp_measure(clothi_qp *s) {
    cloth_qp_report *rep = s->rep;
    int              i, overflow = 0;
    s->precise = 0;
    rep->primal = rep->dual = rep->complementarity = rep->objective = 0;
    rep->active = 0;
    clothi_qp_pull(s);
    for (i = 0; i < s->n; i++) {
        const double x0 = s->q->x0[i], minv = s->q->minv[i], d = s->x[i].h - x0;
        const double size = clothi_max(s->v[i], clothi_max(fabs(s->x[i].h), fabs(x0)));
        if (size > 0) rep->dual = clothi_max(rep->dual, fabs(d + minv * s->u[i].h) / size);
        if (minv > 0) rep->objective += 0.5 * d * d / minv;
        overflow |= !clothi_finite(size + s->u[i].h);
    }
    clothi_qp_slack(s);
    for (i = 0; i < s->m; i++) {
        const double w = s->w[i].h / s->size[i];
        rep->primal = clothi_max(rep->primal, -w);
        overflow |= !clothi_finite(s->size[i] + s->lambda[i].h);
        if (!(s->lambda[i].h > 0)) continue;
        rep->complementarity = clothi_max(rep->complementarity, fabs(w));
        rep->active++;
        s->lambda[i].h = ldexp(s->lambda[i].h, -s->exponent[i]);
        overflow |= !clothi_finite(s->lambda[i].h);
    }
    if (overflow) rep->primal = CLOTHI_HUGE;
    rep->residual = clothi_max(rep->primal, clothi_max(rep->dual, rep->complementarity));
}

static cloth_status clothi_qp_check(const cloth_qp *q, const cloth_qp_options *o) {
    const cloth_hooks *hooks = &o->hooks;
    cloth_status       status;
    int                i, nz;
    if (!q) return clothi_null(hooks, "qp");
    if (!q->minv || !q->x0 || (q->m && (!q->row || !q->h)))
        return clothi_null(hooks, !q->minv ? "qp.minv" : !q->x0 ? "qp.x0" : !q->row ? "qp.row" :
                                  "qp.h");
    if (!(o->tolerance > 0) || !clothi_finite(o->tolerance))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.tolerance = %g: it is above 0",
                           o->tolerance);
    status = clothi_check_count(hooks, "options.", "max_iterations", o->max_iterations, 0,
                                0x7fffffff);
    if (!status) status = clothi_check_count(hooks, "qp.", "n", q->n, 1, 0x3fffffff);
    if (!status) status = clothi_check_count(hooks, "qp.", "m", q->m, 0, 0x0fffffff);
    if (!status) status = clothi_check_each(hooks, "qp.minv", q->minv, q->n, 0, 0);
    if (!status) status = clothi_check_vector(hooks, "qp.x0", q->x0, q->n);
    if (status || !q->m) return status;
    for (i = 0; i <= q->m; i++)
        if (i ? q->row[i] < q->row[i - 1] : q->row[i] != 0)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.row[%i] = %i: rows begin at 0, and "
                               "each where the last one ends", i, q->row[i]);
    nz = q->row[q->m];
    if (nz && !(q->col && q->val)) return clothi_null(hooks, q->col ? "qp.val" : "qp.col");
    status = clothi_check_indices(hooks, CLOTH_ERR_ARGUMENT, "qp.", "col", q->col, nz, 1, q->n);
    if (!status) status = clothi_check_vector(hooks, "qp.val", q->val, nz);
    if (!status) status = clothi_check_vector(hooks, "qp.h", q->h, q->m);
    if (!status) status = clothi_check_vector(hooks, "options.guess", o->guess, q->m);
    return status;
}

static cloth_status clothi_qp_run(clothi_qp *s, const cloth_qp_options *o) {
    cloth_qp_report *rep = s->rep;
    cloth_status     status;
    int              i, violated = -1;
    if (!clothi_qp_layout(s, (size_t)s->q->row[s->m])) return CLOTH_ERR_MEMORY;
    status = clothi_qp_scale(s);
    if (!status) status = clothi_qp_columns(s);
    if (status) return status;
    clothi_qp_digits(s, 0);
    clothi_qp_matrix(s);
    rep->outcome = CLOTH_QP_MAX_ITERATIONS;
    for (i = 0; i < s->m; i++) {            /* rows without a free unknown go, or cannot hold */
        s->keep[i] = clothi_qp_diagonal(s, i) > CLOTHI_QP_CANCELLED;
        rep->dropped += !s->keep[i];
        if (!s->keep[i] && s->w[i].h < -CLOTHI_QP_COPY * s->size[i]) violated = i;
    }
    if (violated >= 0) {
        s->lambda[violated].h = 1;
        if (clothi_qp_prove(s)) return CLOTH_OK;
    }
    clothi_qp_drop_copies(s);
    clothi_qp_order(s);
    for (i = 0; i < s->m; i++)
        s->act[i] = s->keep[i] && (o->guess ? o->guess[i] > 0
                                            : s->w[i].h < 0 && !clothi_qp_shadowed(s, i));
    for (i = 0; i < 3; i++) {
        status = i ? clothi_qp_active_set(s, i - 1) : clothi_qp_pivot(s);
        if (status || rep->outcome == CLOTH_QP_INFEASIBLE) return status;
        if (s->wrong && i < 2) continue;
        clothi_qp_measure(s);
        if (!(rep->residual <= o->tolerance)) rep->outcome = CLOTH_QP_MAX_ITERATIONS;
        else if (i < 2) rep->outcome = CLOTH_QP_SOLVED;
        if (rep->outcome == CLOTH_QP_SOLVED) return CLOTH_OK;
    }
    (void)clothi_qp_prove(s);               /* multipliers that grew without end may be a proof */
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_qp_solve(const cloth_qp *qp, const cloth_qp_options *opt, double *x,
                                      double *lambda, cloth_qp_report *rep) {
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  report;
    cloth_qp_work    own;
    clothi_qp        s;
    cloth_status     status;
    int              i;
    memset(&report, 0, sizeof report);
    if (rep) *rep = report;
    if (opt && opt->cookie != CLOTHI_QP_COOKIE) return CLOTH_ERR_UNINIT;
    if (opt) o = *opt;
    status = clothi_qp_check(qp, &o);
    if (status) return status;
    memset(&own, 0, sizeof own);
    memset(&s, 0, sizeof s);
    own.hooks = o.hooks;
    s.q = qp, s.hooks = &o.hooks, s.rep = &report;
    s.work = o.work ? o.work : &own;
    s.m = qp->m, s.n = qp->n;
    s.most = o.max_iterations ? o.max_iterations : 0x7fffffff;
    if (!o.max_iterations && qp->m < 200000000) s.most = 100 + 10 * qp->m;
    if (s.m) status = clothi_qp_run(&s, &o);
    else report.outcome = CLOTH_QP_SOLVED;
    if (status == CLOTH_ERR_CANCELLED)
        clothi_fail(&o.hooks, status, "the cancel hook stopped the QP");
    if (!status && !(report.residual < CLOTHI_HUGE))
        status = clothi_fail(&o.hooks, CLOTH_ERR_NONFINITE, "qp: x or lambda would be %g: the "
                             "numbers are out of range", report.residual);
    for (i = 0; i < s.n && !status && x; i++) x[i] = s.m ? s.x[i].h : qp->x0[i];
    for (i = 0; i < s.m && !status && lambda; i++) lambda[i] = s.lambda[i].h;
    if (!status && rep) *rep = report;
    (void)clothi_blocks(&own.hooks, (const void *const *)own.data, CLOTHI_QP_BUFFERS);
    return status;
}

/* ===== [7.1] CLOSED SURFACES, DISTANCE GRID ==================================================
 *
 *              _____              A closed mesh says of every point how often it is wrapped round
 *        0    /  A  \__           it, its winding number: 1 inside of A or B, 2 where they overlap,
 *      p . - -|- 1 -| 2|\- -> +x  0 outside, -1 in a part turned inside out. Inside of the mesh is
 *             \_____|__| 1 \      where it is 1 or more: the union of what overlaps.
 *                    \_____/
 *
 *   winding(p) = sum over the triangles that the ray p + t e_x, t > 0, meets:     [JKS13] eq. (2)
 *                1 where it leaves the mesh (normal along +x), -1 where it enters
 *
 *   turn      in the plane of y and z the triangle winds round p by [up edges beyond p] - [down
 *             edges beyond p], beyond along +y: an edge counts when it passes from z <= p.z to
 *             z > p.z, and is beyond when (lower end, upper end, p) turn left
 *   ahead     t > 0 when the volume (a, b, c, p) has the sign of the turn
 *
 * All are exact signs [3.1], so that the number is that of the doubles given, 1e-9 or one
 * rounding from the surface as anywhere. Ties fall as if p were moved by infinitely little, along x
 * by more than along y and along y by more than along z: a ray through an edge or a corner counts
 * it once, and on the surface the number is that of one of its sides.
 *
 * [JKS13] Jacobson, Kavan, Sorkine-Hornung: Robust Inside-Outside Segmentation using Generalized
 * Winding Numbers, SIGGRAPH 2013.
 * checked: tests/test_surface.c */

#define CLOTHI_VOLUME 1e-9                  /* of a mesh: that of a flat part, by rounding     */

/* What a mesh lacks: half-edges 3 face + corner, -1 when nothing does. */
typedef struct clothi_surface_defects {
    int open;                               /* not as many faces run one way as the other      */
    int turned;                             /* of two faces that run the same way              */
    int branch;                             /* of more than two faces                          */
    int inward;                             /* face of a closed part whose volume is below 0   */
    double volume;                          /* m^3, of all that is closed                      */
} clothi_surface_defects;

/* closed [nf] = 1 for the faces of components (joined along edges) at all of whose edges as many
 * faces run one way as the other: these have a winding number; may be NULL. *d: the first
 * defects; a manifold mesh without cavities, closed and oriented outwards, has none. Indices are in
 * range.   returns CLOTH_OK, CLOTH_ERR_MEMORY | cost O(nv + nf) */
static cloth_status clothi_surface_check(const cloth_hooks *hooks, int nv, int nf, const double *x,
                                         const int *faces, unsigned char *closed,
                                         clothi_surface_defects *d) {
    clothi_edge_sort s;
    cloth_status     status = clothi_edge_sort_make(hooks, nv, nf, faces, &s);
    double          *volume = NULL, n[3], a[3];
    int             *up = NULL, i, j, end, f;
    d->open = d->turned = d->branch = d->inward = -1, d->volume = 0;
    if (status != CLOTH_OK) return status;
    volume = (double *)clothi_alloc(hooks, (size_t)nf, 2 * sizeof(double));
    status = volume ? CLOTH_OK : CLOTH_ERR_MEMORY;
    if (status) goto done;
    up = (int *)(void *)(volume + nf);
    if (!closed) closed = (unsigned char *)(up + nf);
    for (f = 0; f < nf; f++) up[f] = f, closed[f] = 1;
    for (i = 0; i < 3 * nf; i = end) {
        const int h = s.order[i];
        int       sum = 0;                  /* of the faces at an edge: one way less the other */
        for (end = clothi_edge_run(&s, 3 * nf, i), j = i; j < end; j++) {
            const int from = faces[s.order[j]], to = faces[clothi_halfedge_next(s.order[j])];
            sum += (from < to) - (from > to);
            (void)clothi_join(up, h / 3, s.order[j] / 3);
        }
        if (sum != 0) closed[h / 3] = 0;
        if (sum != 0 && (d->open < 0 || h < d->open)) d->open = h;
        if (abs(sum) == 2 && end - i == 2 && (d->turned < 0 || h < d->turned)) d->turned = h;
        if (end - i > 2 && (d->branch < 0 || h < d->branch)) d->branch = h;
    }
    for (f = 0; f < nf; f++) closed[clothi_find_root(up, f)] &= closed[f];
    for (f = 0; f < nf; f++) {              /* the root of a part is its first face */
        const int part = clothi_find_root(up, f);
        if (!(closed[f] = closed[part])) continue;
        clothi_face_cross(x, faces + 3 * f, n);
        clothi_sub3(x + 3 * faces[3 * f], x + 3 * faces[3 * part], a);
        volume[part] += clothi_dot3(a, n) / 6, d->volume += clothi_dot3(a, n) / 6;
    }
    for (f = nf - 1; f >= 0; f--)
        if (volume[f] < -CLOTHI_VOLUME * fabs(d->volume)) d->inward = f;
done:
    clothi_free(hooks, volume);
    clothi_free(hooks, s.lo);
    return status;
}

/* How often the closed faces wrap round p [3], m: exact for coordinates in range of [3.1].
 * cost O(log nf + faces on the ray), 0.4 us of 26 000 */
static int clothi_surface_winding(const clothi_surface *s, const double *p) {
    const double    ray[6] = {p[0], p[1], p[2], CLOTHI_HUGE, p[1], p[2]};
    clothi_bvh_walk w = {s->tree, ray, 1, 0, 0};
    int             f, k, sum = 0;
    while ((f = clothi_bvh_next(&w)) >= 0) {
        const int    *v = s->faces + 3 * f;
        const double *x[4];
        int           turn = 0;
        if (s->closed && !s->closed[f]) continue;
        for (k = 0; k < 4; k++) x[k] = s->x + 3 * v[k % 3];
        for (k = 0; k < 3; k++) {
            const int     up = x[k][2] <= p[2];
            const double *lo = x[up ? k : k + 1], *hi = x[up ? k + 1 : k];
            if (up != (x[k + 1][2] <= p[2]) && clothi_turn_of(lo, hi, p, 0) > 0)
                turn += up ? 1 : -1;
        }
        if (turn && turn * clothi_orient3d(x[0], x[1], x[2], p) > 0) sum += turn;
    }
    return sum;
}

/* Segment p q against the closed triangle a b c, touching included: 1 when it goes to the side of
 * the normal, -1 when it comes from there, 0 when they are apart or both ends are in the plane.
 * Exact. The crossing point is not computed here. */
static int clothi_surface_pierced(const double *p, const double *q, const double *a,
                                  const double *b, const double *c) {
    const double *const t[3] = {a, b, c};
    const int           sp = clothi_orient3d(a, b, c, p), sq = clothi_orient3d(a, b, c, q);
    if (sp == sq || !clothi_edge_meets(p, q, sp, sq, t)) return 0;
    return sp > sq ? 1 : -1;
}

static double clothi_surface_far(int f, const double *p, const void *ctx) {
    const clothi_surface *s = (const clothi_surface *)ctx;
    double                b[3];
    if ((s->skip && s->skip[f]) || (s->closed && !s->closed[f])) return HUGE_VAL;
    return clothi_face_distance2(s->x, s->faces + 3 * (size_t)f, p, b);
}

/* The face nearest to p of those that have an inside and are not to be skipped, of several the
 * first; -1 when there is none, d2 and b are as before then.
 * in/out d2    m^2, in: no farther than this, finite; out: its squared distance
 * out    b     [3] barycentric coordinates of the nearest point */
static int clothi_surface_nearest(const clothi_surface *s, const double *p, double *d2, double *b) {
    const int f = clothi_bvh_nearest(s->tree, p, NULL, clothi_surface_far, s, d2);
    if (f >= 0) (void)clothi_face_distance2(s->x, s->faces + 3 * (size_t)f, p, b);
    return f;
}

/* covered [nf] = 1 for the faces that lie inside of another part of the mesh, or bound nothing: no
 * face meets them beyond what they share, and the winding numbers just outside of them and just
 * inside, one more, are both 1 or more, or neither: that outside is not 0, 1e-12 of the largest
 * coordinate off the centroid and places at the corners, along the axis nearest to the normal.
 * (What lies flat on a part of a face, but for a gap of rounding, covers some of these.) The others
 * hold the boundary of the union, and walls between parts that stand flush.
 * cost a ray a face and the pairs of boxes, 45 ms for 26 000 faces */
static cloth_status clothi_surface_covered(const cloth_hooks *hooks, const clothi_surface *s,
                                           int nf, unsigned char *covered) {
    clothi_pairs pairs;
    cloth_status status;
    double       size = 0;
    int          i, j, k;
    memset(&pairs, 0, sizeof pairs);
    for (i = 0; i < nf; i++) covered[i] = 1;
    status = clothi_bvh_look(hooks, s->tree, s->tree, NULL, clothi_crossing_look, s, &pairs);
    for (i = 0; i < 2 * pairs.count; i++) covered[pairs.pair[i]] = 0;
    for (i = 0; i < 3 * nf; i++) size = clothi_max(size, clothi_max_abs(s->x + 3 * s->faces[i], 3));
    for (i = 0; i < nf && status == CLOTH_OK; i++) {
        const int *v = s->faces + 3 * (size_t)i;
        double     n[3], p[3];
        int        w;
        clothi_face_cross(s->x, v, n);
        w = fabs(n[0]) >= fabs(n[1]) ? 0 : 1;
        w = fabs(n[2]) > fabs(n[w]) ? 2 : w;
        for (j = 3; j >= 0 && covered[i]; j--) {
            for (k = 0; k < 3; k++)
                p[k] = s->x[3 * v[j % 3] + k] * (j < 3 ? 0.998 : 1.0 / 3) +
                       (s->x[3 * v[(j + 1) % 3] + k] + s->x[3 * v[(j + 2) % 3] + k]) *
                       (j < 3 ? 0.001 : 1.0 / 3);
            p[w] += ((n[w] > 0) - (n[w] < 0)) * 1e-12 * size;
            covered[i] = clothi_surface_winding(s, p) != 0;
        }
    }
    clothi_pairs_free(hooks, &pairs);
    return status;
}

/* --- distance grid ---
 *
 * One query a node, no farther than the band, which starts from the face nearest to the last node.
 * Faces inside another part are left out: the nearest point is on the boundary of the union, but
 * for nodes inside the overlap that are nearer to the inner half of a face at its border.
 *
 *        o . . . . o           The sign of a node is that of its winding number. From a node that
 *        |<-- d -->|           is d away from the surface the way to the next one, when it is
 *      --o----o----o---        shorter, crosses nothing: the sign is the same. Rays are for those
 *             ^ the next       beside the surface.
 *
 * checked: tests/test_grid.c */

#define CLOTHI_GRID_COOKIE  0x64697267u
#define CLOTHI_GRID_TINY    1e-60           /* m, smallest cell: squares and cubes stay normal */
#define CLOTHI_GRID_LARGE   1e60            /* m, largest coordinate                           */
#define CLOTHI_GRID_REACH   1e11            /* cells, largest coordinate                       */

typedef struct clothi_grid {
    cloth_grid  grid;                       /* first: the public pointer is ours               */
    cloth_hooks hooks;
} clothi_grid;

typedef struct clothi_grid_job {
    cloth_grid    *grid;
    clothi_surface surface;
    unsigned char *covered;                 /* [nf] faces that no distance is taken to         */
    clothi_bvh     tree;
} clothi_grid_job;

/* Rows of nodes along x. */
static void clothi_grid_measure(int begin, int end, int worker, void *ctx) {
    const clothi_grid_job *job = (const clothi_grid_job *)ctx;
    const clothi_surface  *s = &job->surface;
    const cloth_grid      *g = job->grid;
    int                    row, i;
    (void)worker;
    for (row = begin; row < end; row++) {
        double *phi = g->phi + (size_t)row * (size_t)g->n[0], p[3], b[3], last = 0, sign = 1;
        int     f = -1;
        p[1] = g->origin[1] + g->cell * (row % g->n[1]);
        p[2] = g->origin[2] + g->cell * (row / g->n[1]);
        for (i = 0; i < g->n[0]; i++) {
            double d2 = g->band * g->band, d = g->band;
            int    found;
            p[0] = g->origin[0] + g->cell * i;
            if (f >= 0) d2 = clothi_min(d2, clothi_face_distance2(s->x, s->faces + 3 * f, p, b));
            found = clothi_surface_nearest(s, p, &d2, b);
            if (found >= 0) f = found;      /* else f, by rounding nearer than its own box */
            if (f >= 0) d = clothi_min(d, sqrt(d2));
            if (!(clothi_max(d, last) > 1.01 * g->cell))
                sign = clothi_surface_winding(s, p) >= 1 ? -1 : 1;
            phi[i] = sign * d;
            last = d;
        }
    }
}

/* The desc's mesh: numbers, indices, closed, volume; the box of the faces' corners: lo [3], hi. */
static cloth_status clothi_grid_check_mesh(const cloth_grid_desc *d, double *lo, double *hi) {
    const cloth_hooks     *hooks = &d->hooks;
    const double           most = clothi_min(CLOTHI_GRID_LARGE, CLOTHI_GRID_REACH * d->cell);
    clothi_surface_defects defects;
    cloth_status           status = clothi_check_vector(hooks, "desc.x", d->x, 3 * d->nv);
    int                    i;
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, d->nv, d->nf, d->faces);
    if (status != CLOTH_OK) return status;
    for (i = 0; i < 9 * d->nf; i++) {
        const int    at = 3 * d->faces[i / 3] + i % 3;
        const double x = d->x[at];
        if (!(fabs(x) <= most))
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "desc.x[%i] = %g is too large for "
                               "cells of %g", at, x, d->cell);
        lo[i % 3] = i < 3 ? x : clothi_min(lo[i % 3], x);
        hi[i % 3] = i < 3 ? x : clothi_max(hi[i % 3], x);
    }
    status = clothi_surface_check(hooks, d->nv, d->nf, d->x, d->faces, NULL, &defects);
    if (status != CLOTH_OK) return status;
    i = defects.open;
    if (i >= 0)
        return clothi_fail(hooks, CLOTH_ERR_MESH, "the mesh is not closed: at edge %i %i of "
                           "faces[%i] as many faces must run one way as the other",
                           d->faces[i], d->faces[clothi_halfedge_next(i)], i / 3);
    if (defects.volume > 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_MESH, "the mesh holds a volume of %g m^3: faces must turn "
                       "counter-clockwise seen from outside", defects.volume);
}

/* Checks the desc and lays the grid out: all of g but phi. */
static cloth_status clothi_grid_plan(const cloth_grid_desc *d, cloth_grid *g) {
    const cloth_hooks *hooks = &d->hooks;
    const size_t       most = d->max_nodes ? d->max_nodes : CLOTH_DEFAULT_GRID_MAX_NODES;
    double             lo[3] = {0, 0, 0}, hi[3] = {0, 0, 0}, margin, nodes = 1, n[3];
    cloth_status       status = clothi_check_counts(hooks, d->nv, d->nf);
    int                a;
    if (status != CLOTH_OK) return status;
    if (!d->x || !d->faces || d->nf < 4)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, !d->x || !d->faces
                           ? "desc.x or desc.faces is NULL" : "desc.nf = %i is below 4",
                           d->nf);
    g->cell = d->cell;
    g->band = d->band != 0 ? d->band : CLOTH_DEFAULT_GRID_BAND * d->cell;
    margin = d->margin != 0 ? d->margin : g->band;
    status = clothi_check_range(hooks, "desc.", "cell", d->cell, CLOTHI_GRID_TINY,
                                CLOTHI_GRID_LARGE, 0);
    if (!status)
        status = clothi_check_range(hooks, "desc.", "band", g->band, 2 * d->cell, HUGE_VAL, 0);
    if (!status)
        status = clothi_check_range(hooks, "desc.", "margin", margin, d->cell, HUGE_VAL, 0);
    if (!status) status = clothi_grid_check_mesh(d, lo, hi);
    if (status != CLOTH_OK) return status;
    for (a = 0; a < 3; a++) {
        n[a] = ceil((hi[a] - lo[a] + 2 * margin) / d->cell) + 1;
        nodes *= n[a];
    }
    if (!(nodes <= (double)most) || !(nodes < 2147483648.0))
        return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "cells of %g m make %g nodes, more than %g",
                           d->cell, nodes, clothi_min((double)most, 2147483647.0));
    for (a = 0; a < 3; a++) {
        g->n[a] = (int)n[a];
        g->origin[a] = lo[a] + 0.5 * (hi[a] - lo[a]) - 0.5 * d->cell * (n[a] - 1);
    }
    return CLOTH_OK;
}

CLOTH_API cloth_grid_desc cloth_grid_desc_default(void) {
    cloth_grid_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = CLOTHI_GRID_COOKIE;
    return d;
}

CLOTH_API cloth_status cloth_grid_create(const cloth_grid_desc *desc, cloth_grid **out) {
    const size_t    head = (sizeof(clothi_grid) + sizeof(double) - 1) / sizeof(double);
    cloth_grid      plan;
    clothi_grid    *made = NULL;
    clothi_grid_job job;
    cloth_status    status;
    size_t          nodes = 1;
    int             a;
    if (out) *out = NULL;
    if (!out || !desc) return CLOTH_ERR_ARGUMENT;
    if (desc->cookie != CLOTHI_GRID_COOKIE) return CLOTH_ERR_UNINIT;
    memset(&plan, 0, sizeof plan);
    memset(&job, 0, sizeof job);
    status = clothi_grid_plan(desc, &plan);
    if (status != CLOTH_OK) return status;
    for (a = 0; a < 3; a++) nodes *= (size_t)plan.n[a];
    made = (clothi_grid *)clothi_alloc(&desc->hooks, nodes + head, sizeof(double));
    job.covered = (unsigned char *)clothi_alloc(&desc->hooks, (size_t)desc->nf, 1);
    job.surface.x = desc->x, job.surface.faces = desc->faces;
    job.surface.tree = &job.tree, job.surface.skip = job.covered;
    status = made && job.covered
                 ? clothi_bvh_faces(&desc->hooks, desc->nv, desc->x, desc->nf, desc->faces,
                                    &job.tree)
                 : CLOTH_ERR_MEMORY;
    if (!status)
        status = clothi_surface_covered(&desc->hooks, &job.surface, desc->nf, job.covered);
    if (!status) {
        made->grid = plan;
        made->grid.phi = (double *)(void *)made + head;
        made->hooks = desc->hooks;
        job.grid = *out = &made->grid;
        clothi_for(&desc->hooks, plan.n[1] * plan.n[2], 16, clothi_grid_measure, &job);
        made = NULL;
    }
    clothi_bvh_free(&desc->hooks, &job.tree);
    clothi_free(&desc->hooks, job.covered);
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
    double f[3], out[3], grad[3], phi, size = 0, ratio;
    int    i[3], a;
    if (!grid || !x || !grid->phi || !(grid->cell > 0)) return CLOTH_ERR_ARGUMENT;
    for (a = 0; a < 3; a++) {
        if (grid->n[a] < 2) return CLOTH_ERR_ARGUMENT;
        if (!clothi_finite(x[a] - grid->origin[a])) return CLOTH_ERR_NONFINITE;
    }
    for (a = 0; a < 3; a++) {
        const double s = x[a] - grid->origin[a], top = grid->cell * (grid->n[a] - 1);
        const double q = clothi_min(clothi_max(s, 0), top), t = q / grid->cell;
        out[a] = s - q;
        size = clothi_max(size, fabs(out[a]));
        i[a] = t < grid->n[a] - 1 ? (int)t : grid->n[a] - 2;
        f[a] = t - i[a];
    }
    phi = clothi_grid_cell(grid, i, f, grad);
    if (size > 0) {                         /* outside the box: scaled, squares may overflow    */
        phi = clothi_max(phi, 0);
        size = clothi_max(size, phi);
        ratio = phi / size * (phi / size);
        for (a = 0; a < 3; a++) ratio += out[a] / size * (out[a] / size);
        ratio = sqrt(ratio);
        for (a = 0; a < 3; a++)
            grad[a] = (out[a] != 0 ? out[a] / size : phi / size * grad[a]) / ratio;
        phi = size > CLOTHI_HUGE / 2 ? CLOTHI_HUGE : size * ratio;
    }
    if (distance) *distance = phi;
    if (gradient) memcpy(gradient, grad, sizeof grad);
    return CLOTH_OK;
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
 * state; a substep goes from share alpha0 to alpha1 of the way between them. A rigid pose keeps the
 * rotation beside the vertices: a sphere that spins does not show it in its centre.
 *
 * Broad phase: pairs of faces whose boxes overlap [5.1], then their features. Boxes hold the way of
 * a feature and half of the reach that is asked for.
 * checked: tests/test_obstacles.c
 */

enum { CLOTHI_VF = 0, CLOTHI_EE = 1, CLOTHI_VP = 2 };   /* vertex-face, edge-edge; vertex with a
                                                           plane or a grid                     */
enum { CLOTHI_FF = -1 };                    /* a pair of faces                                 */

/* Pairs with one key share an elastic slip: a feature of the cloth with one obstacle (b its slot),
 * or with one side of one part of cloth (b = 2 part + side).
 *   feature 0 vertex, 1 edge, 2 face                                                           */
typedef struct clothi_key {
    int feature, cloth, a, b;               /* cloth 1: b is a part and its side               */
} clothi_key;

/* What a contact remembers from step to step: state. */
typedef struct clothi_anchor {
    clothi_key key;
    double     force;                       /* N, normal                                       */
    double     gap;                         /* m, least of its contacts                        */
    double     slip[3];                     /* m, elastic slip, turned with the surface        */
} clothi_anchor;

typedef struct clothi_pair_id {             /* features, by kind; faces: a < b                 */
    int kind, a, b;
} clothi_pair_id;

typedef struct clothi_near {                /* a pair of the broad phase                       */
    clothi_pair_id id;
    int    hit;                             /* CLOTHI_HIT_ bits                                */
    double slack;                           /* m, to where it is felt, or less; and c->gone    */
    double thick;                           /* m, its contact thickness; 0: not known yet      */
    double felt;                            /* m, the gap that it is felt from                 */
    double time;                            /* part of a segment that it leaves free           */
} clothi_near;

typedef struct clothi_frame {               /* of a pair at some x                             */
    double w[4], normal[3];                 /* sum w = 0; towards w > 0                        */
    double gap;                             /* m                                               */
    double energy, force, slope;            /* J, N, N/m by its gap: what the group joins      */
    double own[3];                          /* J, N, N/m: beside the group                     */
    double part;                            /* dE/d energy in the group's E, 0 to 1; by itself */
                                            /* a contact has force + own[1], slope + own[2]    */
} clothi_frame;

typedef struct clothi_contact {             /* a pair of the proximity potential         [8.2] */
    clothi_key key;                         /* sorted by it and by their id                    */
    int    kind, a, b;                      /* its id                                          */
    int    slot;
    int    n, v[4];                         /* world vertices                                  */
    int    first, end;                      /* of them cloth's: v[first] .. v[end - 1]         */
    int    soft;                            /* with a grid: gap may be below 0                 */
    int    beside;                          /* in the template, with less range for that       */
    double range, radius;                   /* m: activation distance; taken off the distance  */
    double room;                            /* m, from there to where the force has no bound   */
    double start;                           /* m, gap at x^n                                   */
    double away;                            /* m into the range: there is no damping before    */
    double base;                            /* J, what both parts have there                   */
    double stiffness;                       /* N/m: k area                                     */
    double friction;                        /* coefficient                                     */
    double slip[3];                         /* m, elastic slip at x^n                          */
    double carry[3];                        /* m, motion of a surface beyond its vertices'     */
    clothi_frame at;                        /* of the x last looked at                         */
    /* lagged: renewed at every iterate */
    double w[4], normal[3];                 /* friction's, which may follow by halves          */
    double share;                           /* of the force, 0 to 1                            */
    double spring;                          /* N/m, more in this iterate's matrix              */
    double aim;                             /* N, its force as the last matrix foretold it     */
    double size, last[3];                   /* m, elastic slip u and its length                */
    double scale;                           /* of the majorizer's curvature along u: 0 or 1    */
    double limit;                           /* N, friction times normal force; lags longer     */
    double gap, force, tangent[3];          /* m, N: normal force; friction on w > 0           */
} clothi_contact;

typedef struct clothi_zone {                /* its slices of the scratch                 [8.4] */
    int          m;                         /* rows of its QP, of 3 size unknowns              */
    int          rows, size, fresh;         /* rows, vertices; a row is of this pass           */
    int         *order, *row, *col, *member;            /* order [rows]: which; member [size]  */
    double      *val, *h, *lambda, *guess, *minv, *x0, *x;
    double       mean;                      /* kg, of a vertex                                 */
    int          iterations, solved;
    cloth_status status;
} clothi_zone;

typedef struct clothi_obstacle {
    int                 used;
    uint32_t            generation;
    cloth_obstacle_kind kind;
    int                 nv, nf;
    int                 v0, f0, e0;         /* first vertex, face and edge in the world        */
    double             *x;                  /* [3 x nv x 3] pose, target, as added             */
    double              turn[2][9];         /* rotation of pose and target                     */
    double              turned[2][9];       /* where the substep starts and ends               */
    double              surface[6];         /* m/s and rad/s, motion of its surface            */
    double              swing[3];           /* -a, a s^2, b s^3 of clothi_contact_carry()      */
    int                *faces;              /* own numbering                                   */
    double              radius, thickness, friction, normal[3];
    double              first_friction;     /* as it was added                                 */
    uint32_t            category, mask;
    int                 self_penetrating;
    uint64_t            shape;              /* hash of what was added: x, faces, a grid        */
    double              way;                /* m, farthest that a vertex goes in the substep   */
    const cloth_grid   *grid;               /* borrowed; NULL but for a GRID                   */
} clothi_obstacle;

typedef struct clothi_tangle clothi_tangle;
typedef struct clothi_adjoint clothi_adjoint;

struct cloth_collide {
    cloth_sim         *sim;
    const cloth_hooks *hooks;
    cloth_hooks        last;                /* the model's, for when the sim went first        */
    cloth_collide_desc desc;
    cloth_collide_part *part;               /* [nparts]                                        */
    int                self;                /* CLOTH_CONTACT_SELF                              */
    double             stiffness;           /* Pa/m                                            */
    double             mean_area;           /* m^2 of a vertex of cloth                        */

    /* world */
    clothi_obstacle *obstacle;
    int     nobstacle, obstacle_cap;
    int     nv, nf;                         /* cloth's                                         */
    int     nw, mf;                         /* world's                                         */
    double  thickest;                       /* m, largest contact thickness                    */
    double  skin;                           /* m, what comes nearer may touch                  */
    double  stride;                         /* m, longest way of anything in the substep; or t */
    /* its arrays, from faces to solid_known: they come and go together */
    int    *faces, *edges;                  /* [mf x 3], [me x 2] those of capsules last       */
    int     me;
    int    *edge_face;                      /* [me x 2] faces at an edge, -1: none             */
    int    *star, *star_face;               /* [nw + 1], [3 mf] faces around a vertex          */
    int    *slot;                           /* [nw] obstacle of a vertex, -1: cloth            */
    double *area;                           /* [nw] m^2, a third of the faces around           */
    double *xa, *xb;                        /* [nw x 3] start and end of the substep           */
    double *x_last;                         /* [nw x 3] end of the last accepted one           */
    unsigned char  *dragging;               /* [mf] scratch: of bodies that may hold a vertex  */
    unsigned char  *pinched;                /* [mf] faces in a pinch                           */
    unsigned char  *moved;                  /* [nw + me + mf] vertices, edges and faces        */
    clothi_features features;
    clothi_bvh      tree, solid;            /* of cloth's and of obstacles' faces              */
    double         *box_v, *box_f;          /* [nw x 6], [mf x 6]                              */
    double         *gone, *travel;          /* [nw + me + mf] m, ways of vertices, edges and
                                               faces since there is a list; with a move's; 0 of
                                               obstacles                                       */
    int             solid_known;            /* which way the obstacles' boxes hold             */
    double *x_ie;                           /* [nv x 3] the candidate                          */
    double *tied;                           /* [nv x 3] kg of what a leader moves; NULL: no ties */
    int    *vertex_part;                    /* [nv]                                            */
    unsigned char *frozen;                  /* [nv] of a zone that went on as one body         */
    clothi_pairs   found;                   /* by the hierarchy                                */

    /* the substep */
    clothi_contact *contact, *spare;        /* sorted by key; spare: those to be sorted in     */
    int             ncontact, contact_cap, spare_cap;
    int            *order;                  /* [order_cap] scratch of sorting                  */
    int             order_cap;
    cloth_contact_row *row;                 /* constraints of zones                            */
    int             nrow, row_cap;
    clothi_near    *pair;                   /* of the broad phase                              */
    int             npair, pair_cap;
    double          h;
    int             begun;                  /* a step is under way                             */
    int             inexact;                /* the last one ended before Newton converged      */
    int             trying;                 /* a point that is not needed: no sentence         */
    int             until;                  /* zones end where this pass begins; 0: when clear */
    double          toi;                    /* of the way to the guess: before it all is free  */
    const double   *at;                     /* [nv x 3] where a move begins                    */
    double         *way;                    /* [nv x 3] it, as far as the list reaches         */
    double          length;                 /* m, mean edge of the template                    */
    double         *x_frame;                /* [nv x 3] where the contacts' frames are         */
    int             framed;                 /* they are                                        */
    int             listed;                 /* c->pair is the list of this substep's moves     */
    int             iterates, renewed;      /* of a search; with new limits of friction        */
    double         *x_list;                 /* [nv x 3] where the iterate is                   */
    double          approach;               /* CLOTHI_APPROACH or CLOTHI_SQUEEZED              */
    /* pinches */
    int            *held_of;                /* [nv] number in holding, -1                      */
    cloth_hold     *caught;                 /* [nv] scratch                                    */
    double         *hold_to;                /* [nv x 3] where what is held is pulled to        */
    double         *hold_by;                /* [nv x 3] where minimising begins for it         */
    unsigned char  *look;                   /* [nv] CLOTHI_HELD and so on; scratch             */
    int             pinching;               /* somebody was caught or let go                   */
    /* zones */
    int    *zone_of, *zone_number;          /* [nv]                                            */
    int    *local, *member;                 /* [nv] number in a zone; by zone, its vertices    */
    clothi_zone *zone;
    int    *zone_order;                     /* [15 nrow] rows by zone, then row, col of QPs    */
    double *qp_val;                         /* [15 nrow] values, then h, lambda, guess         */
    int     zone_cap, zone_order_cap, qp_val_cap;
    double *qp_minv, *qp_x0, *qp_x;         /* [3 nv]                                          */
    const double *zone_v;                   /* [nv x 3] m/s: of velocities; NULL: of x_IE      */
    int     nwork;
    cloth_qp_work  **work;                  /* [nwork], of each worker                         */

    /* state */
    clothi_anchor *anchor, *next;           /* accepted; of the step under way                 */
    int            nanchor, nnext, anchor_cap, next_cap;
    clothi_pair_id *exempt, *now;           /* sorted; accepted, of the step under way         */
    int            nexempt, nnow, exempt_cap, now_cap;
    cloth_hold    *hold, *holding;          /* accepted, of the step under way                 */
    int            nhold, nholding, hold_cap, holding_cap;
    uint64_t       seen;                    /* hash of the accepted x                          */
    const clothi_tangle *tangle;            /* while one is moved: what it lets pass     [8.7] */
    clothi_adjoint *adjoint;                /* while a tape is walked backwards          [8.8] */

    cloth_collide_pair *failed;
    int                 nfailed, failed_cap;
    cloth_collide_report report;
};

/* Room for `need` things of `size` bytes in *array, which keeps what it has; doubles. */
static cloth_status clothi_grow(const cloth_hooks *hooks, void **array, int need, int *cap,
                                size_t size) {
    void *bigger;
    int   want = *cap < 64 ? 64 : *cap;
    if (need <= *cap) return CLOTH_OK;
    while (want < need) want = want > 0x3fffffff ? 0x7fffffff : 2 * want;
    bigger = clothi_alloc(hooks, (size_t)want, size);
    if (!bigger) return CLOTH_ERR_MEMORY;
    if (*array) memcpy(bigger, *array, (size_t)*cap * size);
    clothi_free(hooks, *array);
    *array = bigger;
    *cap = want;
    return CLOTH_OK;
}

#define CLOTHI_ROOM(c, list, need)          /* the same in c->list                             */ \
    clothi_grow((c)->hooks, (void **)&(c)->list, need, &(c)->list##_cap, sizeof *(c)->list)

#define CLOTHI_PUSH(c, list, one)           /* one more in c->list                             */ \
    (CLOTHI_ROOM(c, list, (c)->n##list + 1) ? CLOTH_ERR_MEMORY                                    \
                                            : ((c)->list[(c)->n##list++] = (one), CLOTH_OK))

/* The list `from` of c becomes its list `to`; what `to` was is room for the next. */
#define CLOTHI_TAKE(type, c, to, from)                                                            \
    do {                                                                                          \
        type     *was = (c)->to;                                                                  \
        const int cap = (c)->to##_cap;                                                            \
        (c)->to = (c)->from, (c)->n##to = (c)->n##from, (c)->to##_cap = (c)->from##_cap;          \
        (c)->from = was, (c)->n##from = 0, (c)->from##_cap = cap;                                 \
    } while (0)

/* --- things that begin with integers, in their order --- */

/* Order of n integers that p and q begin with: -1, 0, 1. */
static int clothi_order(const void *p, const void *q, int n) {
    const int *a = (const int *)p, *b = (const int *)q;
    while (n > 1 && *a == *b) a++, b++, n--;
    return (*a > *b) - (*a < *b);
}

/* Where what begins with the m integers of `key` is among things [n x stride bytes] that are sorted
 * by them, or belongs; *there: it is. */
static int clothi_find(const void *things, size_t stride, int n, const void *key, int m,
                       int *there) {
    const char *at = (const char *)things;
    int         low = 0, high = n;
    while (low < high) {
        const int mid = low + (high - low) / 2;
        if (clothi_order(at + (size_t)mid * stride, key, m) < 0) low = mid + 1;
        else high = mid;
    }
    *there = low < n && clothi_order(at + (size_t)low * stride, key, m) == 0;
    return low;
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

/* With a grid, which detection does not look at. */
static int clothi_is_soft(const cloth_collide *c, const clothi_pair_id *p) {
    return p->kind == CLOTHI_VP && c->obstacle[p->b].grid;
}

static void clothi_obstacle_free(const cloth_hooks *hooks, clothi_obstacle *o) {
    const uint32_t generation = o->generation;
    clothi_free(hooks, o->faces);
    clothi_free(hooks, o->x);
    memset(o, 0, sizeof *o);
    o->generation = generation;
}

/* 0: pose of the last accepted state, 1: target, 2: as it was added */
static double *clothi_pose(const clothi_obstacle *o, int which) {
    return o->x + 3 * (size_t)o->nv * (size_t)which;
}

#define CLOTHI_OBSTACLES(c, o)              /* for each slot o that has an obstacle            */ \
    for (o = 0; o < (c)->nobstacle; o++)                                                          \
        if (!(c)->obstacle[o].used) continue;                                                     \
        else

/* NULL, and said by `call`: it is not there. */
static clothi_obstacle *clothi_obstacle_of(const cloth_collide *c, cloth_obstacle id,
                                           const char *call) {
    const uint32_t   at = (uint32_t)id.id - 1u;
    clothi_obstacle *o = c && at < (uint32_t)c->nobstacle ? c->obstacle + at : NULL;
    if (o && o->used && o->generation == id.id >> 32) return o;
    if (c)
        (void)clothi_fail(c->hooks, CLOTH_ERR_HANDLE,
                          "%s: obstacle %i is not there, or no more", call, (int)(at + 1));
    return NULL;
}

static cloth_obstacle clothi_obstacle_id(const cloth_collide *c, int slot) {
    cloth_obstacle id;
    id.id = slot < 0 ? 0 : (uint64_t)c->obstacle[slot].generation << 32 | (uint32_t)(slot + 1);
    return id;
}

CLOTHI_RARE_BEGIN

/* --- the world's arrays --- */

/* c gets the arrays of another collide. Nothing is freed. */
static void clothi_world_take(cloth_collide *c, const cloth_collide *from) {
    memcpy(&c->faces, &from->faces, offsetof(cloth_collide, x_ie) - offsetof(cloth_collide, faces));
}

/* Bytes of these arrays; frees them where hooks say how. */
static size_t clothi_world_blocks(const cloth_collide *c, const cloth_hooks *hooks) {
    const void *const block[] = {c->faces, c->edges, c->features.edges, c->tree.node,
                                 c->solid.node};
    return clothi_blocks(hooks, block, sizeof block / sizeof *block);
}

/* Areas of the template and of obstacles as they were added: not of now, which is no state. */
static void clothi_world_area(cloth_collide *c) {
    double *x = c->xb;                      /* where the trees find it */
    int     f, k, o;
    memset(c->area, 0, (size_t)c->nw * sizeof(double));
    memcpy(x, c->sim->model->x_rest, 3 * (size_t)c->nv * sizeof(double));
    for (c->length = 0, f = 0; f < 3 * c->nf; f++) {
        const double *q = x + 3 * c->faces[clothi_halfedge_next(f)];
        c->length += sqrt(clothi_apart2(x + 3 * c->faces[f], q, 1)) / (3 * c->nf);
    }
    CLOTHI_OBSTACLES(c, o)
        memcpy(x + 3 * c->obstacle[o].v0, clothi_pose(c->obstacle + o, 2),
               3 * (size_t)c->obstacle[o].nv * sizeof(double));
    for (f = 0; f < c->mf; f++) {
        double n[3];
        clothi_face_cross(x, c->faces + 3 * f, n);
        for (k = 0; k < 3; k++) c->area[c->faces[3 * f + k]] += sqrt(clothi_dot3(n, n)) / 6;
    }
}

/* Where everything of the obstacles begins; capsules bring an edge that is no triangle's. */
static int clothi_world_count(cloth_collide *c) {
    int o, capsules = 0;
    c->nw = c->nv, c->mf = c->nf;
    c->thickest = c->desc.thickness;
    CLOTHI_OBSTACLES(c, o) {
        clothi_obstacle *b = c->obstacle + o;
        b->v0 = c->nw, b->f0 = c->mf;
        c->nw += b->nv, c->mf += b->nf;
        c->thickest = clothi_max(c->thickest, b->thickness);
        capsules += b->kind == CLOTH_OBSTACLE_CAPSULE;
    }
    return capsules;
}

/* Where the edges of the obstacles begin; capsules bring theirs. */
static void clothi_world_edges(cloth_collide *c) {
    int o, at = c->features.ne, e = 0;
    CLOTHI_OBSTACLES(c, o) {
        clothi_obstacle *b = c->obstacle + o;
        while (e < c->features.ne && c->edges[2 * e] < b->v0) e++;
        b->e0 = e;
        if (b->kind != CLOTH_OBSTACLE_CAPSULE) continue;
        b->e0 = at;
        c->edges[2 * at] = b->v0;
        c->edges[2 * at++ + 1] = b->v0 + 1;
    }
}

/* Edges, and the faces at edges and around vertices. */
static cloth_status clothi_world_stars(cloth_collide *c) {
    const size_t me = (size_t)c->me, nw = (size_t)c->nw, mf = (size_t)c->mf;
    const clothi_array need[] = {
        {&c->edges, 2 * me, sizeof(int)}, {&c->edge_face, 2 * me, sizeof(int)},
        {&c->star, nw + 1, sizeof(int)}, {&c->star_face, 3 * mf, sizeof(int)},
        {&c->travel, nw + me + mf, sizeof(double)}, {&c->gone, nw + me + mf, sizeof(double)},
        {&c->moved, nw + me + mf, 1}};
    int i;
    if (clothi_arrays(c->hooks, need, 7)) return CLOTH_ERR_MEMORY;
    memcpy(c->edges, c->features.edges, 2 * (size_t)c->features.ne * sizeof(int));
    for (i = 0; i < 2 * c->me; i++) c->edge_face[i] = -1;
    for (i = 0; i < 3 * c->mf; i++) {
        int *f = c->edge_face + 2 * c->features.face_edges[i];
        f[f[0] >= 0] = i / 3;
    }
    clothi_sort_by(3 * c->mf, c->nw, c->faces, NULL, c->star_face, c->star);
    for (i = 0; i < 3 * c->mf; i++) c->star_face[i] /= 3;
    return CLOTH_OK;
}

/* Into a collide without a world; what a failure leaves is for clothi_world_blocks. The trees,
 * whose order zones see, are over where the model starts and what was added: now is no state. */
static cloth_status clothi_world_build(cloth_collide *c) {
    const cloth_model *m = c->sim->model;
    const int    capsules = clothi_world_count(c);
    cloth_status status;
    const size_t nw = (size_t)c->nw, mf = (size_t)c->mf, one = sizeof(int), real = sizeof(double);
    const clothi_array plain[] = {
        {&c->faces, 3 * mf, one}, {&c->slot, nw, one}, {&c->area, nw, real}, {&c->xa, 3 * nw, real},
        {&c->xb, 3 * nw, real}, {&c->x_last, 3 * nw, real}, {&c->box_v, 6 * nw, real},
        {&c->box_f, 6 * mf, real}, {&c->pinched, mf, 1}, {&c->dragging, mf, 1}};
    int i, o;
    status = clothi_arrays(c->hooks, plain, sizeof plain / sizeof *plain);
    if (status) return status;
    memcpy(c->faces, m->faces, 3 * (size_t)c->nf * sizeof(int));
    for (i = 0; i < c->nv; i++) c->slot[i] = -1;
    CLOTHI_OBSTACLES(c, o) {                /* behind the cloth */
        const clothi_obstacle *b = c->obstacle + o;
        for (i = 0; i < b->nv; i++) c->slot[b->v0 + i] = o;
        for (i = 0; i < 3 * b->nf; i++) c->faces[3 * b->f0 + i] = b->faces[i] + b->v0;
    }
    status = clothi_features_build(c->hooks, c->nw, c->mf, c->faces, &c->features);
    if (status) return status;
    c->me = c->features.ne + capsules;
    status = clothi_world_stars(c);
    if (status) return status;
    clothi_world_edges(c);
    clothi_world_area(c);
    status = clothi_bvh_faces(c->hooks, c->nv, m->x, c->nf, c->faces, &c->tree);
    if (!status)
        status = clothi_bvh_faces(c->hooks, c->nw, c->xb, c->mf - c->nf,
                                  c->faces + 3 * (size_t)c->nf, &c->solid);
    c->solid.first = c->nf;
    return status;
}

/* There are bodies that penetrate themselves. */
static int clothi_drags(const cloth_collide *c) {
    int o, drags = 0;
    CLOTHI_OBSTACLES(c, o) drags |= c->obstacle[o].self_penetrating != 0;
    return drags;
}

/* `part`, 0 to 1, of the turn from rotation A to B, about the one axis of B A'. */
static void clothi_turn_part(const double *A, const double *B, double part, double *out) {
    double Q[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}, u[3], w, size, c, t;
    int    i, j, k, big = 0;
    memcpy(out, part < 1 ? A : B, 9 * sizeof *out);
    if (!(part > 0 && part < 1) || memcmp(A, B, 9 * sizeof *A) == 0) return;
    for (i = 0; i < 27; i++) Q[i / 3] += B[3 * (i / 9) + i % 3] * A[3 * (i / 3 % 3) + i % 3];
    for (k = 1; k < 3; k++) big = Q[4 * k] > Q[4 * big] ? k : big;
    i = big, j = (i + 1) % 3, k = (i + 2) % 3;
    if (Q[0] + Q[4] + Q[8] > Q[4 * i]) {    /* the unit quaternion, from its largest number */
        w = 0.5 * sqrt(1 + Q[0] + Q[4] + Q[8]);
        u[0] = (Q[7] - Q[5]) / (4 * w), u[1] = (Q[2] - Q[6]) / (4 * w);
        u[2] = (Q[3] - Q[1]) / (4 * w);
    } else {
        size = sqrt(1 + Q[4 * i] - Q[4 * j] - Q[4 * k]);
        u[i] = 0.5 * size, w = (Q[3 * k + j] - Q[3 * j + k]) / (2 * size);
        u[j] = (Q[3 * i + j] + Q[3 * j + i]) / (2 * size);
        u[k] = (Q[3 * i + k] + Q[3 * k + i]) / (2 * size);
    }
    size = sqrt(clothi_dot3(u, u));
    for (k = 0; k < 3; k++) u[k] = size > 0 ? u[k] / size : 0;
    clothi_circle(part * clothi_atan2(w < 0 ? -size : size, fabs(w)) / CLOTHI_PI, &c, &t);
    for (k = 0; k < 3; k++) {               /* Rodrigues, column by column */
        const double a[3] = {A[k], A[3 + k], A[6 + k]}, along = clothi_dot3(u, a);
        double       turned[3];
        clothi_cross3(u, a, turned);
        for (i = 0; i < 3; i++)
            out[3 * i + k] = a[i] + t * turned[i] + (1 - c) * (along * u[i] - a[i]);
    }
}

CLOTHI_RARE_END

/* World vertices at the poses alpha0 (xa) and alpha1 (xb) of the step; cloth at x in both. */
static void clothi_world_pose(cloth_collide *c, const double *x, double alpha0, double alpha1) {
    double cosine, sine;                    /* of the angle that a surface turns by            */
    int    o, i;
    memcpy(c->xa, x, 3 * (size_t)c->nv * sizeof(double));
    memcpy(c->xb, x, 3 * (size_t)c->nv * sizeof(double));
    CLOTHI_OBSTACLES(c, o) {
        clothi_obstacle *b = c->obstacle + o;
        const double *p = clothi_pose(b, 0), *q = clothi_pose(b, 1);
        const double  w2 = clothi_dot3(b->surface + 3, b->surface + 3), w = sqrt(w2);
        clothi_circle(0.5 * w * c->h / CLOTHI_PI, &cosine, &sine);
        b->swing[1] = w > 0 ? (1 - cosine) / w2 : 0, b->swing[0] = -b->swing[1];
        b->swing[2] = w > 0 ? (c->h - sine / w) / w2 : 0;
        clothi_turn_part(b->turn[0], b->turn[1], alpha0, b->turned[0]);
        clothi_turn_part(b->turn[0], b->turn[1], alpha1, b->turned[1]);
        for (i = 0; i < 3 * b->nv; i++) {
            c->xa[3 * b->v0 + i] = alpha0 > 0 ? p[i] + alpha0 * (q[i] - p[i]) : p[i];
            c->xb[3 * b->v0 + i] = alpha1 < 1 ? p[i] + alpha1 * (q[i] - p[i]) : q[i];
        }
    }
    c->solid_known = 0;
}

/* --- who may touch whom --- */

/* Two world vertices: not both of obstacles, and both of cloth where that collides with itself. */
static int clothi_may_touch(const cloth_collide *c, int v, int w) {
    const int at[2] = {v, w}, self = c->slot[v] < 0 && c->slot[w] < 0;
    uint32_t  category[2] = {1, 1}, mask[2] = {0xffffffffu, 0xffffffffu};
    int       i;
    if ((self && !c->self) || (c->slot[v] >= 0 && c->slot[w] >= 0)) return 0;
    for (i = 0; i < 2; i++) {
        const int                 slot = c->slot[at[i]];
        const cloth_collide_part *part = c->part ? c->part + c->vertex_part[at[i]] : NULL;
        if (slot >= 0) category[i] = c->obstacle[slot].category, mask[i] = c->obstacle[slot].mask;
        else if (part) category[i] = part->category, mask[i] = part->mask;
        if (self && part && !part->self) return 0;
    }
    return (category[0] & mask[1]) != 0 && (category[1] & mask[0]) != 0;
}

/* World vertices of a pair and how many they are. */
static int clothi_pair_vertices(const cloth_collide *c, const clothi_pair_id *p, int *v) {
    if (p->kind == CLOTHI_EE) {
        v[0] = c->edges[2 * p->a], v[1] = c->edges[2 * p->a + 1];
        v[2] = c->edges[2 * p->b], v[3] = c->edges[2 * p->b + 1];
        return 4;
    }
    v[0] = p->a;
    if (p->kind == CLOTHI_VF) {
        memcpy(v + 1, c->faces + 3 * p->b, 3 * sizeof *v);
        return 4;
    }
    v[1] = c->obstacle[p->b].v0;            /* VP: b is the slot */
    return 2;
}

static int clothi_pair_slot(const cloth_collide *c, const clothi_pair_id *p) {
    const int ee = p->kind == CLOTHI_EE, slot = c->slot[ee ? c->edges[2 * p->a] : p->a];
    if (p->kind == CLOTHI_VP) return p->b;
    return slot >= 0 ? slot : c->slot[ee ? c->edges[2 * p->b] : c->faces[3 * p->b]];
}

/* What is taken off every distance to obstacle `slot`, m. */
static double clothi_slot_radius(const cloth_collide *c, int slot) {
    return slot < 0 ? 0 : c->obstacle[slot].radius;
}

static double clothi_slot_thickness(const cloth_collide *c, int slot) {
    return slot < 0 ? c->desc.thickness : c->obstacle[slot].thickness;
}

/* Points of a pair: cloth at x [nv x 3], obstacles at xa where that is x, else where they end. */
static void clothi_pair_points(const cloth_collide *c, const double *x, const int *v, int n,
                               double *out) {
    const double *world = x == c->xa ? x : c->xb;
    int           k;
    for (k = 0; k < n; k++)
        memcpy(out + 3 * k, (v[k] < c->nv ? x : world) + 3 * v[k], 3 * sizeof(double));
}

/* The faces [*n] around a side of a pair, 0 or 1, -1: none; not of a wall. */
static const int *clothi_pair_faces(const cloth_collide *c, const clothi_pair_id *p, int side,
                                    int *n) {
    const int at = side ? p->b : p->a;
    *n = p->kind == CLOTHI_EE ? 2 : side ? 1 : c->star[at + 1] - c->star[at];
    return p->kind == CLOTHI_EE ? c->edge_face + 2 * at : side ? &p->b : c->star_face + c->star[at];
}

/* How far it is in the template from the point |w| of a feature, of vertices v [n], out of the
 * faces around it, m: whatever does not touch them is farther along the mesh. */
static double clothi_way_out(const cloth_collide *c, const int *faces, int nf, const int *v, int n,
                             const double *w) {
    const double *x = c->sim->model->x_rest;
    double        p[3] = {0, 0, 0}, b[3], least = HUGE_VAL;
    int           i, j, k;
    for (i = 0; i < 3 * n; i++) p[i % 3] += fabs(w[i / 3]) * x[3 * v[i / 3] + i % 3];
    for (i = 0; i < 3 * nf && faces[i / 3] >= 0; i++) {
        const int *f = c->faces + 3 * faces[i / 3];
        int        side[3], in = 0;
        side[0] = f[i % 3], side[1] = side[2] = f[(i + 1) % 3];
        for (j = 0; j < 2; j++)
            for (k = 0; k < n; k++) in += side[j] == v[k];
        if (in < n) least = clothi_min(least, clothi_face_distance2(x, side, p, b));
    }
    return sqrt(least);
}

/* The contact thickness of a pair: that of the obstacle, else t; for two places of one cloth that
 * are nearer than 2 t along the template, as far as their faces tell, half of that: a fine mesh is
 * not in contact with itself at rest, and layers of a fold are. */
static double clothi_pair_thickness(const cloth_collide *c, const clothi_pair_id *p,
                                    const int *v) {
    const double t = c->desc.thickness;
    const int    slot = clothi_pair_slot(c, p), first = p->kind == CLOTHI_EE ? 2 : 1;
    const int   *faces;
    double       x[12], w[4], apart;
    int          n;
    if (slot >= 0) return c->obstacle[slot].thickness;
    if (c->vertex_part[v[0]] != c->vertex_part[v[3]]) return t;
    clothi_pair_points(c, c->sim->model->x_rest, v, 4, x);
    apart = clothi_pair_distance(p->kind, x, w);
    if (!(apart < 2 * t)) return t;
    faces = clothi_pair_faces(c, p, 0, &n);
    apart = clothi_max(apart, clothi_way_out(c, faces, n, v, first, w));
    faces = clothi_pair_faces(c, p, 1, &n);
    apart = clothi_max(apart, clothi_way_out(c, faces, n, v + first, 4 - first, w + first));
    return clothi_min(t, 0.5 * apart);
}

/* c->travel: how far the vertices, edges and faces of cloth have gone and go along dx [nv x 3] at
 * most, m. */
static void clothi_move_far(cloth_collide *c, const double *dx) {
    double       *v = c->travel, *e = v + c->nw, *f = e + c->me;
    const double *gone_e = c->gone + c->nw, *gone_f = gone_e + c->me;
    int           i;
    for (i = 0; i < c->nv; i++) v[i] = sqrt(clothi_dot3(dx + 3 * i, dx + 3 * i));
    for (i = 0; i < c->me; i++) {
        const int *w = c->edges + 2 * i;
        if (w[0] < c->nv) e[i] = gone_e[i] + clothi_max(v[w[0]], v[w[1]]);
    }
    for (i = 0; i < c->nf; i++) {
        const int *w = c->faces + 3 * i;
        f[i] = gone_f[i] + clothi_max(clothi_max(v[w[0]], v[w[1]]), v[w[2]]);
    }
    for (i = 0; i < c->nv; i++) v[i] += c->gone[i];
}

/* How much nearer a pair has come at most by ways: c->gone, c->travel. */
static double clothi_pair_far(const cloth_collide *c, const double *ways, const clothi_pair_id *p) {
    const double *e = ways + c->nw, *f = e + c->me;
    if (p->kind == CLOTHI_EE) return e[p->a] + e[p->b];
    return ways[p->a] + (p->kind == CLOTHI_VF ? f[p->b] : 0);
}

/* That of dx, less what its sides move together: the longest difference of the motions of two
 * vertices, as the gap is that of two points between them. */
static double clothi_pair_come(const cloth_collide *c, const clothi_pair_id *p, const double *dx) {
    double most = 0, d[3];
    int    v[4], i, j, k;
    const int n = clothi_pair_vertices(c, p, v), side = p->kind == CLOTHI_EE ? 2 : 1;
    for (i = 0; i < side; i++)
        for (j = side; j < n; j++) {
            for (k = 0; k < 3; k++) {
                d[k] = v[i] < c->nv ? dx[3 * v[i] + k] : 0;
                d[k] -= v[j] < c->nv ? dx[3 * v[j] + k] : 0;
            }
            most = clothi_max(most, clothi_dot3(d, d));
        }
    return sqrt(most);
}

/* Distance left between the sides of a pair, m; x: as in clothi_pair_points. */
static double clothi_pair_gap(const cloth_collide *c, const double *x, const clothi_pair_id *p) {
    const clothi_obstacle *o;
    double                 r[12], w[4];
    int                    v[4];
    const int              n = clothi_pair_vertices(c, p, v);
    clothi_pair_points(c, x, v, n, r);
    if (p->kind != CLOTHI_VP)
        return clothi_pair_distance(p->kind, r, w) - clothi_slot_radius(c, clothi_pair_slot(c, p));
    o = c->obstacle + p->b;
    clothi_sub3(r, r + 3, r);
    if (!o->grid) return clothi_dot3(r, o->normal);
    return cloth_grid_sample(o->grid, r, w, NULL) ? HUGE_VAL : w[0] - o->radius;
}

#define CLOTHI_NO_GAP 1e-14                 /* of coordinates: a gap that is rounding          */
#define CLOTHI_SKIN   2e-5                  /* of t: what is nearer touches; layers hung at a
                                               quarter of it, their pushes lost in rounding    */

/* Whether points r [n x 3] are nearer than `least` m, or by rounding: no side of a gap is right. */
static int clothi_gap_touches(double gap, double least, const double *r, int n) {
    return !(gap > CLOTHI_NO_GAP * clothi_max_abs(r, 3 * n)) || !(gap > least);
}

static int clothi_pair_touches(const cloth_collide *c, const double *x, const clothi_pair_id *p) {
    double    r[12];
    int       v[4];
    const int n = clothi_pair_vertices(c, p, v);
    clothi_pair_points(c, x, v, n, r);
    return clothi_gap_touches(clothi_pair_gap(c, x, p),
                              CLOTHI_SKIN * clothi_pair_thickness(c, p, v), r, n);
}

/* Whether faces f and g at xb intersect, or have features without a common vertex that touch. */
static int clothi_faces_touch(const cloth_collide *c, int f, int g) {
    const int *v = c->faces + 3 * f, *w = c->faces + 3 * g, *e = c->features.face_edges;
    int        i, q[4];
    if (clothi_faces_parted(c->xb, v, w, c->skin)) return 0;
    for (i = 0; i < 15; i++) {
        const int            ee = i < 9, k = i % 3;
        const clothi_pair_id p = {ee ? CLOTHI_EE : CLOTHI_VF, ee ? e[3 * f + i / 3] : i < 12 ? v[k]
                                  : w[k], ee ? e[3 * g + k] : i < 12 ? g : f};
        (void)clothi_pair_vertices(c, &p, q);
        if (!clothi_face_has(q + 1, q[0]) && (!ee || (q[1] != q[2] && q[1] != q[3])) &&
            clothi_pair_touches(c, c->xb, &p))
            return 1;
    }
    return clothi_faces_intersect(c->xb, v, w);
}

static void clothi_touch_look(int a, int b, const void *ctx, clothi_segment *out) {
    if (clothi_faces_touch((const cloth_collide *)ctx, a, b)) clothi_segment_put(out, a, b);
}

/* --- broad phase --- */

static cloth_status clothi_pair_add(cloth_collide *c, int kind, int a, int b) {
    const clothi_near p = {{kind, a, b}, 0, 0, 0, 0, 0};
    int               v[4];
    (void)clothi_pair_vertices(c, &p.id, v);
    if (!clothi_may_touch(c, v[0], v[kind == CLOTHI_EE ? 2 : 1])) return CLOTH_OK;
    return CLOTHI_PUSH(c, pair, p);
}

enum { CLOTHI_SWEPT = 1, CLOTHI_ENDED = 2 };    /* of obstacles: their whole way; where it ends */
enum { CLOTHI_MOVED = 1, CLOTHI_TOUCH = 2 };    /* only of what c->moved names; faces that touch */

/* Boxes and tree of cloth or, in the world, of obstacles on the way from p to q (NULL: at rest). */
static void clothi_tree_boxes(cloth_collide *c, clothi_bvh *tree, const double *p, const double *q,
                              double pad) {
    const int    solid = tree == &c->solid, nf = solid ? c->mf - c->nf : c->nf;
    const size_t v = solid ? (size_t)c->nv : 0, f = solid ? (size_t)c->nf : 0;
    clothi_swept_boxes(solid ? c->nw - c->nv : c->nv, p + 3 * v, q ? q + 3 * v : NULL, pad,
                       c->box_v + 6 * v);
    clothi_face_boxes(nf, c->faces + 3 * f, c->box_v, c->box_f + 6 * f);
    clothi_bvh_refit(c->hooks, tree, c->box_f + 6 * f);
}

/* Nothing makes pairs: no self-contact, and all obstacles are walls. */
static int clothi_only_walls(const cloth_collide *c) {
    int o, others = c->self;
    CLOTHI_OBSTACLES(c, o) others |= !clothi_is_wall(c->obstacle + o);
    return !others;
}

/* What intersects, into the sorted list, once. */
static cloth_status clothi_exempt_add(cloth_collide *c, const clothi_pair_id *p) {
    cloth_status status = CLOTH_OK;
    int          there, at = clothi_find(c->now, sizeof *p, c->nnow, p, 3, &there);
    if (!there) status = CLOTHI_ROOM(c, now, c->nnow + 1);
    if (there || status) return status;
    memmove(c->now + at + 1, c->now + at, (size_t)(c->nnow++ - at) * sizeof *p);
    c->now[at] = *p;
    return CLOTH_OK;
}

/* Of cloth's edges and faces those move of whose vertices c->moved names one. */
static void clothi_move_features(cloth_collide *c) {
    unsigned char *v = c->moved, *e = v + c->nw, *f = e + c->me;
    const int     *w = c->faces;
    int            i;
    for (i = 0; i < c->nf; i++, w += 3) f[i] = v[w[0]] | v[w[1]] | v[w[2]];
    for (w = c->edges, i = 0; i < c->me; i++, w += 2) e[i] = v[w[0]] | v[w[1]];
}

static int clothi_pair_moved(const cloth_collide *c, int kind, int a, int b) {
    const unsigned char *e = c->moved + c->nw, *f = e + c->me;
    if (kind == CLOTHI_EE) return e[a] | e[b];
    return c->moved[a] | (kind == CLOTHI_VF ? f[b] : 0);
}

/* Pairs of cloth's faces with those of a tree, by the boxes of both; faces that touch go into
 * c->now. */
static cloth_status clothi_tree_phase(cloth_collide *c, const clothi_bvh *with, int what) {
    const clothi_features_job job = {&c->features, c->box_v, c->box_f};
    const int       touch = what & CLOTHI_TOUCH, moved = what & CLOTHI_MOVED;
    clothi_look_fn *look = touch ? clothi_touch_look : clothi_features_look;
    cloth_status    status;
    int             i;
    status = clothi_bvh_look(c->hooks, &c->tree, with, moved ? c->moved + c->nw + c->me : NULL,
                             look, touch ? (const void *)c : &job, &c->found);
    for (i = 0; i < c->found.count && !status; i++) {
        const int           *p = c->found.pair + 2 * i;
        const clothi_pair_id face = {CLOTHI_FF, p[0], p[1]};
        if (touch && !clothi_may_touch(c, c->faces[3 * p[0]], c->faces[3 * p[1]])) continue;
        if (touch) status = clothi_exempt_add(c, &face);
        else if (p[0] < 0) status = clothi_pair_add(c, CLOTHI_EE, ~p[0], ~p[1]);
        else status = clothi_pair_add(c, CLOTHI_VF, p[0], p[1]);
    }
    return status;
}

/* All spheres and capsules: a centre or two ends against faces, an axis against edges. */
static cloth_status clothi_all_round(cloth_collide *c) {
    cloth_status    status = CLOTH_OK;
    double          box[6];
    clothi_bvh_walk all = {&c->tree, box, 1, 0, 0}, w;
    int             o, f, k;
    CLOTHI_OBSTACLES(c, o) {
        const clothi_obstacle *b = c->obstacle + o;
        if (b->nf || clothi_is_wall(b)) continue;
        memcpy(box, c->box_v + 6 * b->v0, sizeof box);
        if (b->nv == 2) clothi_box_join(box, c->box_v + 6 * (b->v0 + 1), box);
        for (k = 0; k < 3; k++) box[k] -= b->radius, box[3 + k] += b->radius;
        for (w = all; !status && (f = clothi_bvh_next(&w)) >= 0;) {
            const int *e = c->features.face_edges + 3 * f, owned = c->features.owned[f] >> 3;
            for (k = 0; k < b->nv && !status; k++)
                status = clothi_pair_add(c, CLOTHI_VF, b->v0 + k, f);
            for (k = 0; k < 3 && b->nv == 2 && !status; k++)
                if (owned >> k & 1) status = clothi_pair_add(c, CLOTHI_EE, e[k], b->e0);
        }
    }
    return status;
}

/* c->pair: what comes within `reach` (m); cloth on its way from p to q [nv x 3] (NULL: at rest),
 * obstacles as `solid` says. what: bits of CLOTHI_MOVED, CLOTHI_TOUCH; pairs with walls and round
 * obstacles are listed anyway. Where cloth flies the mean of its motion is left out for pairs with
 * itself: a sheet thrown through a room meets itself no more than at rest. */
static cloth_status clothi_broad_phase(cloth_collide *c, const double *p, const double *q,
                                       int solid, double reach, int what) {
    const int    swept = solid == CLOTHI_SWEPT, flies = c->self && swept;
    double       mean[3] = {0, 0, 0}, *to = c->qp_x0;
    cloth_status status = CLOTH_OK;
    int          i, o;
    c->npair = 0;
    if (what & CLOTHI_TOUCH)
        reach = c->skin = 2 * clothi_max(CLOTHI_SKIN * c->thickest,
                                         CLOTHI_NO_GAP * clothi_max_abs(c->xb, 3 * c->nw));
    CLOTHI_OBSTACLES(c, o)                  /* walls: with all vertices */
        for (i = 0; clothi_is_wall(c->obstacle + o) && i < c->nv && !status; i++)
            status = clothi_pair_add(c, CLOTHI_VP, i, o);
    if (status || clothi_only_walls(c)) return status;
    if (flies) {
        for (i = 0; i < 3 * c->nv; i++) mean[i % 3] += (q[i] - p[i]) / c->nv;
        for (i = 0; i < 3 * c->nv; i++) to[i] = q[i] - mean[i % 3];
        clothi_tree_boxes(c, &c->tree, p, to, 0.5 * reach);
        status = clothi_tree_phase(c, &c->tree, what);
    }
    if (c->solid_known != solid) {          /* their pad is the thickest, whatever is asked now */
        clothi_tree_boxes(c, &c->solid, c->xb, swept ? c->xa : NULL,
                          0.5 * clothi_max(reach, c->thickest));
        c->solid_known = reach > c->thickest ? 0 : solid;
    }
    clothi_tree_boxes(c, &c->tree, p, q, 0.5 * reach);
    if (!status) status = clothi_tree_phase(c, &c->solid, what);
    if (!status && c->self && !flies) status = clothi_tree_phase(c, &c->tree, what);
    return status ? status : clothi_all_round(c);
}

/* --- what intersects from the start --- */

static int clothi_pair_held(const cloth_collide *c, const clothi_pair_id *p);
static cloth_status clothi_hold_eval(const cloth_collide *c, const cloth_eval *e, double *energy);
static int clothi_tangle_passes(const cloth_collide *c, const clothi_pair_id *p);

/* 1 when a vertex of cloth is, where the substep begins, outside of a world face of a body that
 * penetrates itself: nothing lets it in. */
static int clothi_outside(const cloth_collide *c, int v, int face) {
    const int *f = c->faces + 3 * face;
    double     d[3], n[3];
    if (v >= c->nv || c->slot[f[0]] < 0 || !c->obstacle[c->slot[f[0]]].self_penetrating) return 0;
    clothi_face_cross(c->xa, f, n);
    clothi_sub3(c->xa + 3 * v, c->xa + 3 * f[0], d);
    return clothi_dot3(n, d) > 0;
}

/* A pair is exempt when it is held in a pinch, when it is listed, or when it belongs to a listed
 * pair of faces. */
static int clothi_is_exempt(const cloth_collide *c, const clothi_pair_id *p) {
    const int *f, *g;
    int        i, j, n, m, there = 0;
    if (c->nholding > 0 && clothi_pair_held(c, p)) return 1;
    if (c->tangle && clothi_tangle_passes(c, p)) return 1;
    if (c->nnow) (void)clothi_find(c->now, sizeof *p, c->nnow, p, 3, &there);
    if (there || c->nnow == 0 || p->kind == CLOTHI_VP) return there;
    f = clothi_pair_faces(c, p, 0, &n), g = clothi_pair_faces(c, p, 1, &m);
    for (i = 0; i < n; i++)
        for (j = 0; j < m; j++) {
            const clothi_pair_id ff = {CLOTHI_FF, f[i] < g[j] ? f[i] : g[j],
                                       f[i] < g[j] ? g[j] : f[i]};
            (void)clothi_find(c->now, sizeof ff, c->nnow, &ff, 3, &there);
            if (ff.a >= 0 && there) return p->kind == CLOTHI_EE || !clothi_outside(c, p->a, p->b);
        }
    return 0;
}

/* Whether a pair touches at xb. The axis of a capsule, whose first vertex the pair has, may go
 * through a face, near none of its edges and its ends far off. */
static int clothi_pair_meets(const cloth_collide *c, const clothi_pair_id *p) {
    const double *x = c->xb, *axis = x + 3 * p->a;
    const int    *v = c->faces + 3 * p->b;
    int           slot;
    if (p->kind == CLOTHI_FF) return clothi_faces_touch(c, p->a, p->b);
    slot = clothi_pair_slot(c, p);
    if (p->kind == CLOTHI_VF && slot >= 0 && p->a == c->obstacle[slot].v0 &&
        c->obstacle[slot].kind == CLOTH_OBSTACLE_CAPSULE &&
        clothi_surface_pierced(axis, axis + 3, x + 3 * v[0], x + 3 * v[1], x + 3 * v[2]))
        return 1;
    return clothi_pair_touches(c, x, p);
}

/* Everything that intersects or touches now, cloth and obstacles where xb has them, into c->now. */
static cloth_status clothi_crossings(cloth_collide *c) {
    cloth_status status;
    int          i;
    c->nnow = 0;
    status = clothi_broad_phase(c, c->xb, NULL, CLOTHI_ENDED, 0, CLOTHI_TOUCH);
    for (i = 0; i < c->npair && !status; i++) {
        const clothi_pair_id *p = &c->pair[i].id;
        if (!clothi_is_soft(c, p) && clothi_pair_meets(c, p)) status = clothi_exempt_add(c, p);
    }
    return status;
}

/* Names of a pair outside: what is of an obstacle counts in its own mesh. */
static cloth_collide_pair clothi_public_pair(const cloth_collide *c, const clothi_pair_id *q) {
    const clothi_obstacle *o;
    cloth_collide_pair     p;
    int                    slot;
    memset(&p, 0, sizeof p);
    p.a = q->a, p.b = q->b;
    p.faces = q->kind == CLOTHI_FF;
    p.edge_edge = q->kind == CLOTHI_EE;
    slot = p.faces ? c->slot[c->faces[3 * q->b]] : clothi_pair_slot(c, q);
    p.obstacle = clothi_obstacle_id(c, slot);
    if (slot < 0) return p;
    o = c->obstacle + slot;
    p.reversed = !p.faces && c->slot[p.edge_edge ? c->edges[2 * q->a] : q->a] >= 0;
    if (p.reversed) p.a -= p.edge_edge ? o->e0 : o->v0;
    else p.b -= q->kind == CLOTHI_VP ? p.b : p.edge_edge ? o->e0 : o->f0;
    return p;
}

/* The public names of pairs [n], which stay where obstacles come and go, into c->failed. */
static cloth_status clothi_name_pairs(cloth_collide *c, const clothi_pair_id *pair, int n) {
    cloth_status status = CLOTH_OK;
    int          i;
    for (c->nfailed = 0, i = 0; i < n && !status; i++)
        status = CLOTHI_PUSH(c, failed, clothi_public_pair(c, pair + i));
    if (status) c->nfailed = 0;
    return status;
}

/* Lists pairs [n] as what failed; says what is wrong with them, and what may be done. */
static cloth_status clothi_fail_pairs(cloth_collide *c, const clothi_pair_id *pair, int n,
                                      const char *what, const char *advice) {
    static const char *const name[4] = {"vertex", "face", "edge", "face or slot"};
    const cloth_collide_pair *p;
    const cloth_status        status = clothi_name_pairs(c, pair, n);
    int                       a, b;
    if (status || n == 0) return status ? status : CLOTH_ERR_STEP;
    p = c->failed;
    a = p->faces ? 1 : p->edge_edge ? 2 : 0, b = a ? a : p->reversed ? 1 : 3;
    return clothi_fail(c->hooks, CLOTH_ERR_STEP, "contact at t = %g s: %i pairs %s; the first: "
                       "cloth's %s %i and %s %i of %s%s", c->sim->state.t, n, what,
                       name[p->reversed ? b : a], p->reversed ? p->b : p->a,
                       name[p->reversed ? a : b], p->reversed ? p->a : p->b,
                       p->obstacle.id ? "an obstacle" : "cloth", advice);
}

/* Looks for what touches; what is not named as exempt is refused or exempted as the desc says. */
static cloth_status clothi_contact_check(cloth_collide *c) {
    const cloth_status status = clothi_crossings(c);
    int                i, k, n = 0;
    for (i = 0; i < c->nnow && !status && c->desc.initial != CLOTH_INITIAL_EXEMPT; i++) {
        const cloth_collide_pair p = clothi_public_pair(c, c->now + i);
        for (k = 0; k < c->nfailed && memcmp(c->failed + k, &p, sizeof p) != 0; k++) {}
        if (k == c->nfailed) c->now[n++] = c->now[i];
    }
    c->nfailed = 0;
    if (status || n == 0) return status;
    return clothi_fail_pairs(c, c->now, n, "intersect or touch before the step",
                             ". Begin with gaps of a thickness; or CLOTH_INITIAL_EXEMPT lets them "
                             "pass until they part, and cloth_collide_untangle() parts them");
}

static uint64_t clothi_contact_seen(const cloth_collide *c) {
    return clothi_hash(0xcbf29ce484222325u, c->sim->state.x, 3 * (size_t)c->nv * sizeof(double));
}

/* c->now and the x of the sim are accepted. */
static void clothi_exempt_accept(cloth_collide *c) {
    CLOTHI_TAKE(clothi_pair_id, c, exempt, now);
    c->seen = clothi_contact_seen(c);
}

/* Drops what has parted, at the end of an accepted step. */
static void clothi_exempt_part(cloth_collide *c) {
    int i, n = 0;
    for (i = 0; i < c->nnow; i++)
        if (clothi_pair_meets(c, c->now + i)) c->now[n++] = c->now[i];
    c->nnow = n;
}

/* ===== [8.2] PROXIMITY AND FRICTION ==========================================================
 *
 *        gap = |sum w x| - radius, w and n of the closest points, at every iterate
 *        |
 *    t --+- - - - - - - - - - -  range: from here on the cloth feels the obstacle
 *        +- - - - - - - - - - -  0.28 t, that detection leaves to begin with             [8.4]
 *   t/4 -+- - - - - - - - - - -  d_min, the pole p: here the force has no bound
 *     0 =========================
 *
 * A pair within range has, with u = t - gap, U = t - p, k = stiffness x area and tau = relaxation
 * (where places of one cloth are near along the template, t is less, and k more by as much),
 *
 *     force = k u^2/(t (1 - u/U)^2)  -  k tau (gap - gap^n)/h       never below 0
 *
 * an elastic part and a damping. Of the first, with z = u/U, the energy is
 *
 *     k U^3/t (z + z/(1 - z) + 2 log(1 - z)),
 *
 * twice differentiable where contact begins, as in [LFS20], but of the third order in u: it starts
 * softer; and with a pole of the second: what is pressed a million times harder than k t keeps
 * 1/1000 of its room, not 1/10^6, and its slope is so much smaller. A sheet under its weight rests
 * at t - 0.08 t. What begins a step nearer than the pole has its pole at 0.98 of that distance:
 * nothing creeps in under load.
 *
 * Groups. A vertex of cloth meets many faces, edges and vertices of one body: as a sum of their
 * energies a finer mesh would push more. Contacts of one feature (of two edges: the first) with an
 * obstacle, or with one side of one part of cloth, have one key and one energy, E = |(e_1, e_2,
 * ...)|_p with p = 8: the nearest one's, smooth where two are as near. A pair of edges counts by
 * the share in which it is needed at x^n: where both surfaces are convex there, where their middles
 * cross and where they are not parallel; what has no full share has a guard, a barrier of its own
 * in the last quarter above the pole, beside the group: all that detection guards has one. What has
 * none, two thirds of a T-shirt's pairs in range, is a contact from its guard on. Beside groups are
 * also pairs near in the template: ranges of micrometres say nothing in a norm with those of t.
 *
 * Hessian: e'' grad grad' and the curvature of the gap by itself where that is positive, which
 * rocking faces need (clothi_frame_bends); for groups that of the norm, by all their vertices: a
 * vertex in a fold of two faces has up to seven times the stiffness of both by themselves.
 *
 * A step of Newton's that would run into the pole says little: f is not linear. Moves are cut
 * there, what cuts one becomes a contact, and each contact keeps the force that the matrix foretold
 * for dx, as the multiplier is kept in a primal-dual method: the secant to it is the stiffness at
 * the next iterate (clothi_contact_secant). What was tried and lost, here and in friction:
 * tests/bench/bench_contact.c.
 *
 * Friction, with N the normal force of this step, v the tangential motion since the anchor was set
 * and eps = desc.slip:
 *
 *     E = mu N ( v^2/eps - v^3/(3 eps^2)   |v| <= eps: sticks;      |v| - eps/3   beyond: slides )
 *
 * a potential for fixed N and frame. N follows the normal forces at every iterate whose residual is
 * less than 1e-2 of friction's limits at the vertices that carry half of them: farther away it
 * would be that of a motion that will not be (a strip began to slip around a cylinder and flew
 * off); till then that of the step before, on the contacts that a key has now. The search ends at
 * such an iterate where the limits change by less than 5 % of their sum; a tolerance above t/20
 * loosens both by as much (1e-2 m: half of the time of a sheet on a ball). Half of them: a few
 * slivers of a garment's mesh hold more than all its contacts. Friction that moves its cloth by
 * less than 1e-3 of the tolerance counts for none of this: that of layers just t apart is rounding,
 * and was waited for to the cap. What has been renewed eight times in a search, limits or frames,
 * follows by halves: a closest point that slides takes v with it, and two iterates can lead to each
 * other for ever (of 16 impacts at a tolerance of 1e-8 m, 8 ended so at the cap). When the step is
 * accepted the anchor keeps v, cut to eps and turned with the surface: what sticks does not creep
 * (Cundall and Strack 1979). A sheet on a plane slides 0.02 % less than Coulomb's at mu = 0.99 tan
 * a, and sticks within 0.6 mm at 1.01. Friction's Hessian along v is 0 beyond eps; where the last
 * iterate turned v round, the majorizer's mu N/|v|.
 *
 * Distance grids. No detection stands behind the potential, and cloth may be inside: along the way
 * of a vertex the grid is sampled, and where it comes nearer than 3 t, gap and n are taken and
 * reckoned back to x^n. The force is capped at k t; the damping, of tau = 20 ms at least, begins at
 * t: what lies deep comes out at t/tau.
 *
 * [LFS20] Li et al., Incremental Potential Contact, ACM TOG 39 (2020), doi 10.1145/3386569.3392425.
 * checked: tests/test_friction.c (differences), test_contact.c, test_grid_contact.c, test_pose.c,
 *   tests/validate/slide.c, incline.c, stopping.c, resting.c, drop.c, capstan.c
 */

#define CLOTHI_SEPARATION 0.28              /* of t: what detection leaves to begin with       */
#define CLOTHI_GAP        0.5               /* of t: target gap of zones                       */
#define CLOTHI_APPROACH   0.98              /* of the distance at x^n: the pole where nearer   */
#define CLOTHI_SQUEEZED   0.3               /* where zones find no way with that               */
#define CLOTHI_CONVEX     0.15              /* rad: from here on a convex feature counts fully */
#define CLOTHI_GUARD      0.25              /* of the room above the pole: range without share */
#define CLOTHI_WEIGHT     1e-12             /* of a closest point: less is rounding            */
#define CLOTHI_PARALLEL   0.03              /* sin^2 of an angle: edges nearer to parallel     */
#define CLOTHI_POLE       0.25              /* of t: d_min, where the force has no bound       */
#define CLOTHI_AWAY       8                 /* iterations, to the last bits                    */
#define CLOTHI_FREE       8                 /* renewals of what friction lags, without damping */
#define CLOTHI_SOFT_NEAR  3                 /* t, from a grid at x^n: felt from range on       */
#define CLOTHI_SOFT_LOOKS 64                /* samples along the way to a grid, at most        */
#define CLOTHI_SOFT_FLAT  1e-3              /* |grad phi| below which there is no way out      */
#define CLOTHI_SOFT_TIME  0.02              /* s, least relaxation at a grid                   */
#define CLOTHI_SOFT_ROOM  1e6               /* t: no pole                                      */
#define CLOTHI_CONTACT_GRAIN 256            /* contacts a range                                */

/* c/h, N/m. */
static double clothi_contact_damping(const cloth_collide *c, const clothi_contact *q) {
    const double tau = c->desc.relaxation;
    return q->stiffness * (q->soft ? clothi_max(tau, CLOTHI_SOFT_TIME) : tau) / c->h;
}

/* ln a of an ordinary a > 0, within 2 ulp of 1 or of itself: libm's differ in last bits. */
static double clothi_log(double a) {
    double m, s, sum = 0;
    int    k, e;
    m = frexp(a, &e);
    if (m < 0.7071067811865476) m *= 2, e--;
    s = (m - 1) / (m + 1);                  /* ln m = 2 (s + s^3/3 + s^5/5 + ..) */
    for (k = 21; k > 0; k -= 2) sum = 1.0 / k + s * s * sum;
    return e * 0.6931471805599453 + 2 * s * sum;
}

/* K u^2/(t (1 - u/U)^2), u m into the range t of which U ends at the pole: force N and slope N/m
 * are added up. */
static void clothi_barrier(double K, double t, double U, double u, double *force, double *slope) {
    const double r = U / (U - u);
    if (!(u > 0 && u / U < 1)) return;
    *force += K / t * u * u * r * r;
    *slope += 2 * K / t * u * r * r * r;
}

/* Its energy, J. */
static double clothi_barrier_energy(double K, double t, double U, double u) {
    const double z = u / U, r = U / (U - u);
    double       series = 0;
    int          i;
    if (!(u > 0)) return 0;
    if (!(z < 1)) return HUGE_VAL;
    if (z > 0.1) return K * U / t * U * U * (z + z * r + 2 * clothi_log(1 - z));
    for (i = 19; i >= 3; i--)                   /* the same without cancellation */
        series = series * z + (i - 2.0) / i;
    return K / t * u * u * u * series;
}

/* Elastic part of the potential at gap g: force N and slope N/m. A grid's force is capped. */
static void clothi_contact_elastic(const clothi_contact *q, double g, double *force,
                                   double *slope) {
    const int capped = q->soft && q->range - g > q->range;
    *force = capped ? q->stiffness * q->range : 0, *slope = 0;
    if (!capped) clothi_barrier(q->stiffness, q->range, q->room, q->range - g, force, slope);
}

static double clothi_elastic_energy(const clothi_contact *q, double g) {
    const double K = q->stiffness, t = q->range, u = t - g;
    if (!(q->soft && u > t)) return clothi_barrier_energy(K, t, q->room, u);
    return K * t * (u - 2 * t / 3);
}

/* How far into the range of a contact its damping ends, m: there K u^2/(t (1 - u/U)^2) is
 * damp (in - u). Newton's method from the root without the square, beyond which it is convex. */
static double clothi_contact_away(const cloth_collide *c, const clothi_contact *q) {
    const double damp = clothi_contact_damping(c, q), in = q->range - q->start, U = q->room;
    const double a = q->stiffness / q->range;
    double       u, force, slope;
    int          i;
    if (!(damp > 0 && in > 0)) return 0;
    u = 2 * damp * in * U /
        (damp * (in + U) + sqrt(damp * damp * (in - U) * (in - U) + 4 * a * U * damp * in * U));
    for (i = 0; i < CLOTHI_AWAY; i++) {
        force = slope = 0;
        clothi_barrier(q->stiffness, q->range, U, u, &force, &slope);
        u -= (force - damp * (in - u)) / (slope + damp);
    }
    return q->soft && u > q->range ? in - q->stiffness * q->range / damp : u;
}

/* Force and slope of a contact by its gap, and where asked its energy: its share of the elastic
 * part and of the damping, 0 beyond the gap where both balance; the guard of what has no share. */
static void clothi_contact_normal(const cloth_collide *c, const clothi_contact *q, int energy,
                                  clothi_frame *f) {
    const double damp = clothi_contact_damping(c, q), U = q->room, u = q->range - f->gap;
    const double K = (1 - q->share) * q->stiffness, v = u - (1 - CLOTHI_GUARD) * U;
    const double back = damp * (f->gap - clothi_min(q->start, q->range));
    f->force = f->slope = f->energy = f->own[0] = f->own[1] = f->own[2] = 0;
    if (!(f->gap < q->range - q->away)) return;
    if (!(u < U)) f->force = f->energy = HUGE_VAL;          /* at the pole or beyond */
    if (!(u < U)) return;
    clothi_contact_elastic(q, f->gap, &f->force, &f->slope);
    if (energy) f->energy = clothi_elastic_energy(q, f->gap);
    if (energy && damp > 0) f->energy += 0.5 * back * back / damp;
    if (damp > 0) f->force -= back, f->slope += damp;
    f->force *= q->share, f->slope *= q->share;
    f->energy = q->share * clothi_max(f->energy - q->base, 0);
    if (q->share < 1) {
        const double t = CLOTHI_GUARD * q->range, top = CLOTHI_GUARD * U;
        clothi_barrier(K, t, top, v, f->own + 1, f->own + 2);
        if (energy) f->own[0] = clothi_barrier_energy(K, t, top, v);
    }
    if (!q->beside) return;
    f->own[0] += f->energy, f->own[1] += f->force, f->own[2] += f->slope;
    f->energy = f->force = f->slope = 0;
}

/* r [3]: from vertex v to its neighbour o at x^n, across the edge e [3] of vertices `edge` (NULL:
 * none), of which *along is taken off. Returns how far that falls off on the side that d looks to,
 * in CLOTHI_CONVEX. */
static double clothi_fall(const cloth_collide *c, int v, int o, const int *edge, const double *d,
                          double *r, double *e, double *along) {
    const double *x = c->xa;
    double        size;
    int           k;
    clothi_sub3(x + 3 * o, x + 3 * v, r);
    if (edge) {
        clothi_sub3(x + 3 * edge[1], x + 3 * edge[0], e);
        *along = clothi_dot3(r, e) / clothi_dot3(e, e);
        for (k = 0; k < 3; k++) r[k] -= *along * e[k];
    }
    size = sqrt(clothi_dot3(r, r));
    return size > 0 ? -clothi_dot3(r, d) / (CLOTHI_CONVEX * size) : 1;
}

/* 0 when it does not, 1 from the angle CLOTHI_CONVEX on. */
static double clothi_falls_off(const cloth_collide *c, int v, int o, const int *edge,
                               const double *d) {
    double       r[3], e[3], along;
    const double fall = clothi_fall(c, v, o, edge, d, r, e, &along);
    return fall > 0 ? fall < 1 ? fall * fall * (3 - 2 * fall) : 1 : 0;
}

/* The corner of face k at edge e that is across from it; -1: no such face. */
static int clothi_edge_across(const cloth_collide *c, int e, int k) {
    const int *v = c->edges + 2 * e, f = 3 * c->edge_face[2 * e + k];
    return f < 0 ? -1 : c->faces[f] + c->faces[f + 1] + c->faces[f + 2] - v[0] - v[1];
}

/* The same for both faces at edge e, and for all neighbours of vertex v. d [3]: away from the
 * feature, towards what it meets. */
static double clothi_edge_convex(const cloth_collide *c, int e, const double *d) {
    const int *v = c->edges + 2 * e;
    double     share = 1;
    int        k, o;
    for (k = 0; k < 2; k++)
        if ((o = clothi_edge_across(c, e, k)) >= 0) share *= clothi_falls_off(c, *v, o, v, d);
    return share;
}

/* *least: the first of the neighbours that fall off least, -1: all do fully. */
static double clothi_vertex_convex(const cloth_collide *c, int v, const double *d, int *least) {
    double share = 1;
    int    i;
    *least = -1;
    for (i = 3 * c->star[v]; i < 3 * c->star[v + 1]; i++) {
        const int    w = c->faces[3 * c->star_face[i / 3] + i % 3];
        const double own = w == v ? 1 : clothi_falls_off(c, v, w, NULL, d);
        if (own < share) share = own, *least = w;
    }
    return share;
}

/* Share of its force that a pair has, by its frame f at x^n: where surfaces are flat or hollow,
 * vertices near faces say all of their distance; a vertex of an obstacle counts where it is convex.
 * Edges near to parallel have none, as their closest point jumps from end to end: nor have those
 * along a capsule, which others of their ends' edges touch as well (a strip around one took 35
 * iterations a step, and takes 4). Were it renewed at every iterate, edges that slide over others
 * would keep the search from its end. */
static double clothi_contact_share(const cloth_collide *c, const clothi_contact *q,
                                   const clothi_frame *f) {
    double p[12], e[3], r[3], n[3], d[3], s = f->w[1], t = -f->w[3], sine, a, b;
    int    k;
    if (q->kind == CLOTHI_VP || f->gap > 2 * q->range) return 1;
    for (k = 0; k < 3; k++) d[k] = -f->normal[k];
    if (q->kind == CLOTHI_VF)
        return q->a < c->nv || q->radius > 0 ? 1 : clothi_vertex_convex(c, q->a, d, &k);
    clothi_pair_points(c, c->xa, q->v, 4, p);
    clothi_sub3(p + 3, p, e);
    clothi_sub3(p + 9, p + 6, r);
    clothi_cross3(e, r, n);
    a = clothi_dot3(e, e) * clothi_dot3(r, r);
    sine = a > 0 ? clothi_dot3(n, n) / a / CLOTHI_PARALLEL : 0;
    b = q->radius > 0 ? 1 : 16 * s * (1 - s) * t * (1 - t);
    b *= b * (sine < 1 ? sine * (2 - sine) : 1);
    if (b > 0 && q->v[0] >= c->nv) b *= clothi_edge_convex(c, q->a, d);
    if (b > 0 && q->v[2] >= c->nv) b *= clothi_edge_convex(c, q->b, f->normal);
    return b;
}

/* Whether a vertex comes near a grid on its straight way to the iterate x; then the frame where it
 * does, the gap reckoned back to x^n. */
static int clothi_contact_soft(const cloth_collide *c, clothi_contact *q, const double *x) {
    const clothi_obstacle *o = c->obstacle + q->b;
    const double t = q->range, *a = c->xa, *b = c->xb;
    const double close = clothi_min(CLOTHI_SOFT_NEAR * t, 0.5 * (t + o->grid->band - o->radius));
    const int    v = 3 * q->v[0], at = 3 * q->v[1];
    double       p[3], way[3], d = 0, s = 0, size, slope;
    int          i, k;
    for (k = 0; k < 3; k++) way[k] = x[v + k] - a[v + k] - (b[at + k] - a[at + k]);
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
    q->start = d - s * clothi_dot3(way, q->normal);
    clothi_sub3(a + v, a + at, p);
    q->radius = clothi_dot3(p, q->normal) - q->start;
    q->room = CLOTHI_SOFT_ROOM * t;
    q->soft = 1, q->share = 1;
    return 1;
}

/* Gap, weights and normal of a contact at x. */
static void clothi_contact_frame_at(const cloth_collide *c, const clothi_contact *q,
                                    const double *x, clothi_frame *f) {
    double p[12], r[3] = {0, 0, 0}, d = 0;
    int    i, k;
    clothi_pair_points(c, x, q->v, q->n, p);
    if (q->kind != CLOTHI_VP) d = clothi_pair_distance(q->kind, p, f->w);
    if (!(d > 0)) {
        memcpy(f->w, q->w, sizeof f->w);
        memcpy(f->normal, q->normal, sizeof f->normal);
    }
    for (i = 0; i < q->n; i++)
        for (k = 0; k < 3; k++) r[k] += f->w[i] * p[3 * i + k];
    for (k = 0; d > 0 && k < 3; k++) f->normal[k] = r[k] / d;
    f->gap = (d > 0 ? d : clothi_dot3(r, f->normal)) - q->radius;
}

static void clothi_frame_range(int begin, int end, int worker, void *ctx) {
    cloth_collide *c = (cloth_collide *)ctx;
    int            i;
    (void)worker;
    for (i = begin; i < end; i++) {
        clothi_contact *q = c->contact + i;
        clothi_contact_frame_at(c, q, c->x_frame, &q->at);
        clothi_contact_normal(c, q, 1, &q->at);
    }
}

/* a^8, without pow: libm's differ in last bits. */
static double clothi_eighth(double a) { return a * a * (a * a) * (a * a * (a * a)); }

/* Contacts of one key are one: E = |(e_1, e_2, ...)|_p, p = 8. Sets the parts of contacts
 * q [n], returns E, J. */
static double clothi_contact_group(clothi_contact *q, int n) {
    double most = 0, sum = 0, E;
    int    i;
    for (i = 0; i < n; i++) most = clothi_max(most, q[i].at.energy), q[i].at.part = 0;
    if (!(most > 0)) return 0;
    for (i = 0; i < n; i++) sum += clothi_eighth(q[i].at.energy / most);
    E = most * sqrt(sqrt(sqrt(sum)));
    for (i = 0; i < n; i++) {
        const double r = q[i].at.energy / E, r2 = r * r;
        q[i].at.part = r * r2 * r2 * r2;
    }
    return E;
}

/* End of the group that contact i begins. */
static int clothi_group_end(const cloth_collide *c, int i) {
    int j = i + 1;
    while (j < c->ncontact && clothi_order(c->contact + j, c->contact + i, 4) == 0) j++;
    return j;
}

/* Frames of all contacts at x. */
static void clothi_contact_frames(cloth_collide *c, const double *x) {
    const size_t bytes = 3 * (size_t)c->nv * sizeof(double);
    if (c->framed && memcmp(c->x_frame, x, bytes) == 0) return;
    memcpy(c->x_frame, x, bytes);
    c->framed = 1;
    clothi_for(c->hooks, c->ncontact, CLOTHI_CONTACT_GRAIN, clothi_frame_range, c);
}

/* Way of a contact since its anchor was set, m, by its lagged weights. */
static void clothi_contact_way(const cloth_collide *c, const clothi_contact *q, const double *x,
                               double *u) {
    int i, k;
    for (k = 0; k < 3; k++) u[k] = q->slip[k] + q->carry[k];
    for (i = 0; i < q->n; i++) {
        const double *to = (q->v[i] < c->nv ? x : c->xb) + 3 * q->v[i], *at = c->xa + 3 * q->v[i];
        for (k = 0; k < 3; k++) u[k] += q->w[i] * (to[k] - at[k]);
    }
}

/* Its tangential part, the elastic slip. */
static void clothi_contact_slip(const cloth_collide *c, const clothi_contact *q, const double *x,
                                double *u) {
    double along;
    int    k;
    clothi_contact_way(c, q, x, u);
    along = clothi_dot3(u, q->normal);
    for (k = 0; k < 3; k++) u[k] -= along * q->normal[k];
}

/* How far what friction lags goes to what it is now, the n-th time in a search. */
static double clothi_friction_follow(int n) { return n > CLOTHI_FREE ? 0.5 : 1; }

/* out = R1 R0' r: with an obstacle that is turned from R0 to R1. */
static void clothi_turned(const double *R0, const double *R1, const double *r, double *out) {
    double back[3] = {0, 0, 0};
    int    i;
    for (i = 0; i < 9; i++) back[i % 3] += R0[i] * r[i / 3];
    for (i = 0; i < 3; i++) out[i] = clothi_dot3(R1 + 3 * i, back);
}

/* way = h u + w x (a u + b w x u): of a drum's surface in the substep, u its speed at the start and
 * a = swing[1], or at the end and a = swing[0]. */
static void clothi_surface_way(const cloth_collide *c, const clothi_obstacle *o, double a,
                               const double *u, double *way) {
    double s[3], r[3];
    int    k;
    clothi_cross3(o->surface + 3, u, s);
    clothi_cross3(o->surface + 3, s, r);
    for (k = 0; k < 3; k++) way[k] = c->h * u[k] + (a * s[k] + o->swing[2] * r[k]);
}

/* q->carry: how far the obstacle's surface moves at the contact, beyond what its vertices do. Of a
 * drum or a conveyor u = v + w x r, r from the first vertex to where a contact with faces ends, the
 * foot of one with a wall begins. All of its way h u + w x (a u + b w x u): no turn leads outwards.
 * A sphere or capsule turns about its axis, which its vertices carry, from R' r to r at the end. */
static void clothi_contact_carry(const cloth_collide *c, clothi_contact *q) {
    const clothi_obstacle *o = q->slot < 0 ? NULL : c->obstacle + q->slot;
    const int              wall = q->kind == CLOTHI_VP;
    double r[3] = {0, 0, 0}, s[3], u[3], side = 0;
    int    i, k;
    if (!o || !(q->radius > 0 || clothi_max_abs(o->surface, 6) > 0)) return;   /* 0 as it is */
    for (i = 0; i < q->n; i++) side += q->v[i] < c->nv ? 0 : q->w[i];
    for (i = 0; i < q->n; i++)              /* from the first vertex to the contact */
        for (k = 0; k < 3 && (q->v[i] < c->nv) == wall && fabs(side) > 0; k++)
            r[k] += (wall ? 1 : q->w[i] / side) * (c->xa[3 * q->v[i] + k] - c->xa[3 * o->v0 + k]);
    for (k = 0; k < 3; k++) r[k] -= (wall ? q->start : side * q->radius) * q->normal[k];
    clothi_cross3(o->surface + 3, r, u);
    for (k = 0; k < 3; k++) u[k] += o->surface[k];
    clothi_surface_way(c, o, o->swing[wall], u, s);
    for (k = 0; k < 3; k++) {
        q->carry[k] = side * s[k];
        r[k] = -q->radius * q->normal[k];   /* times side, twice */
    }
    clothi_turned(o->turned[1], o->turned[0], r, s);
    for (k = 0; k < 3 && !clothi_is_wall(o); k++) q->carry[k] += r[k] - s[k];
}

/* Lagged frame and slip from the frame at x. */
static void clothi_contact_renew(const cloth_collide *c, clothi_contact *q, const double *x) {
    const double a = clothi_friction_follow(c->iterates);
    double       u[3], size;
    int          i;
    for (i = 0; i < 4; i++) q->w[i] = a * q->at.w[i] + (1 - a) * q->w[i];
    for (i = 0; i < 3; i++) u[i] = a * q->at.normal[i] + (1 - a) * q->normal[i];
    size = sqrt(clothi_dot3(u, u));
    for (i = 0; i < 3; i++) q->normal[i] = size > 0.5 ? u[i] / size : q->at.normal[i];
    q->gap = q->at.gap;
    clothi_contact_carry(c, q);
    clothi_contact_slip(c, q, x, u);
    size = sqrt(clothi_dot3(u, u));
    if (!(size > c->desc.slip)) q->scale = 1;
    else if (q->size > 0) q->scale = !(clothi_dot3(u, q->last) > 0.5 * q->size * q->size);
    memcpy(q->last, u, sizeof u);
    q->size = size;
}

/* Friction by its limit and slip, 1/m, at a slip of `size`; *less, 1/m^3: how much less it is along
 * the slip, beyond it. */
static double clothi_friction_law(double eps, double size, double *less) {
    const double most = clothi_max(size, eps);
    *less = size > 0 ? 1 / (size * (most * most)) : 0;
    return size < eps ? 2 / eps - size / (eps * eps) : 1 / size;
}

/* Friction of a contact: energy J; tangent [3] N, K [3x3] N/m on sum w x. */
static double clothi_contact_friction(const cloth_collide *c, const clothi_contact *q,
                                      const double *x, double *tangent, double *K) {
    const double eps = c->desc.slip;
    double       u[3], size, bend, less;
    int          i, j;
    clothi_contact_slip(c, q, x, u);
    size = sqrt(clothi_dot3(u, u));
    bend = clothi_friction_law(eps, size, &less);
    for (i = 0; i < 3; i++) {
        tangent[i] = q->limit * bend * u[i];
        for (j = 0; j < 3; j++)
            K[3 * i + j] = q->limit * (bend * ((i == j) - q->normal[i] * q->normal[j]) -
                                       (1 - q->scale) * less * u[i] * u[j]);
    }
    return q->limit * (size < eps ? size * size * (1 / eps - size / (3 * eps * eps))
                                  : size - eps / 3);
}

/* How the weights of a frame change along what the closest points can slide on: rate [2 x 4] by the
 * parameters s that are not at an end, along [2 x 3] = d(sum w x)/ds, m. Returns their number. */
static int clothi_frame_rates(const clothi_contact *q, const double *w, const double *x,
                              double *rate, double *along) {
    int n = 0, first = -1, i, j, k;
    memset(rate, 0, 8 * sizeof(double));
    for (i = 0; i < q->n && q->kind != CLOTHI_VP; i++) {
        if (!(fabs(w[i]) > CLOTHI_WEIGHT) || (q->kind == CLOTHI_VF && i == 0)) continue;
        if (first < 0 || (q->kind == CLOTHI_EE && i >= 2 && first < 2)) {
            first = i;
            continue;
        }
        rate[4 * n + first] = w[i] < 0 ? 1 : -1;
        rate[4 * n + i] = -rate[4 * n + first];
        n++;
    }
    for (j = 0; j < n; j++)
        for (k = 0; k < 3; k++)
            for (along[3 * j + k] = 0, i = 0; i < q->n; i++)
                along[3 * j + k] += rate[4 * j + i] * x[3 * i + k];
    return n;
}

/* Rows whose squares, times the force, are the part of the Hessian of -gap that is not negative,
 * by cloth coordinates [m x 12]; returns m. Closest points slide on their features: with D = |sum
 * w x|, r_s = d(sum w x)/ds and G = r_s' r_s,
 *
 *      -d2 gap/dx2 = D (a + b) G^-1 (a + b)' - w w' (1 - n n')/D,      a = dw/ds n,  b = w r_s/D
 *
 * Along the r_s the last term takes b b' away again: what only slides on a plane has no curvature.
 * Across them it is negative and left out. a and b are orthogonal, so that a a' + a b' + b a' has
 * one positive eigenvalue. */
static int clothi_frame_bends(const cloth_collide *c, const clothi_contact *q, const double *x,
                              double *row) {
    const clothi_frame *f = &q->at;
    const double       *w = f->w + q->first;
    const int           n = q->end - q->first;
    double    p[12], rate[8], along[6], G[3], d = f->gap + q->radius;
    int       m, i, j, k, used = 0;
    clothi_pair_points(c, x, q->v, q->n, p);
    m = d > 0 ? clothi_frame_rates(q, f->w, p, rate, along) : 0;
    if (!m) return 0;
    G[0] = sqrt(clothi_dot3(along, along));
    G[1] = m > 1 ? clothi_dot3(along, along + 3) / G[0] : 0;
    G[2] = m > 1 ? clothi_dot3(along + 3, along + 3) - G[1] * G[1] : 0;
    if (m > 1 && !(G[2] > 1e-4 * clothi_dot3(along + 3, along + 3))) m = 1;
    for (k = 0; k < 4; k++) {               /* times the inverse of G's factor */
        rate[k] /= G[0];
        if (m > 1) rate[4 + k] = (rate[4 + k] - G[1] * rate[k]) / sqrt(G[2]);
    }
    for (k = 0; k < 3; k++) {
        along[k] /= G[0];
        if (m > 1) along[3 + k] = (along[3 + k] - G[1] * along[k]) / sqrt(G[2]);
    }
    for (j = 0; j < m; j++) {
        const double *a = rate + 4 * j + q->first;
        double        a2 = 0, b2 = 0, most, size;
        for (i = 0; i < n; i++) a2 += a[i] * a[i], b2 += w[i] * w[i] / (d * d);
        if (!(a2 > 0)) continue;
        most = 0.5 * (a2 + sqrt(a2 * a2 + 4 * a2 * b2));
        size = sqrt(d * most * a2 / (most * most + a2 * b2));
        for (i = 0; i < 3 * n; i++)
            row[12 * used + i] = size * (most / a2 * a[i / 3] * f->normal[i % 3] +
                                         w[i / 3] * along[3 * j + i % 3] / d);
        used++;
    }
    return used;
}

/* A definite model of the Hessian of part e(g): e'' w w' n n', with the spring of
 * clothi_contact_secant, and that of the gap. K [3x3], N/m: of friction. */
static cloth_status clothi_contact_hessian(const cloth_collide *c, const clothi_contact *q,
                                           const double *x, const double *K, cloth_matrix *A) {
    const clothi_frame *f = &q->at;
    const double       *w = q->w + q->first;
    const int           n = 3 * (q->end - q->first);
    double    row[36], H[144], press = f->part * f->force + f->own[1];
    double    stiff = sqrt(f->part * f->slope + f->own[2] + q->spring);
    const int m = press > 0 ? clothi_frame_bends(c, q, x, row + 12) : 0;
    int       i, j, k;
    for (i = 0; i < n; i++) {
        row[i] = stiff * f->w[q->first + i / 3] * f->normal[i % 3];
        for (k = 1; k <= m; k++) row[12 * k + i] *= sqrt(press);
    }
    for (i = 0; i < n; i++)
        for (j = 0; j < 3 * (i / 3 + 1); j++) {         /* what the matrix reads */
            double h = 0;
            for (k = 0; k <= m; k++) h += row[12 * k + i] * row[12 * k + j];
            if (K) h += w[i / 3] * w[j / 3] * K[3 * (i % 3) + j % 3];
            H[n * i + j] = h;
        }
    return cloth_matrix_add_element(A, n / 3, q->v + q->first, H);
}

#define CLOTHI_GROUP 16                     /* vertices whose contacts of a key are coupled    */
#define CLOTHI_LOUD  0.3                    /* of the energy of a key: from here on coupled    */

/* The cloth of contact q joins the vertices v [*m] of its key, of at most `most`; row [3 x *m]:
 * de/dx of the contact there. Returns 0: it has little of it, or no room. */
static int clothi_group_row(const clothi_contact *q, double E, int most, int *v, int *m,
                            double *row) {
    int at[4], n = *m, i, k;
    if (!(q->at.energy > CLOTHI_LOUD * E)) return 0;
    for (i = q->first; i < q->end; i++) {
        for (k = 0; k < n && v[k] != q->v[i]; k++) {}
        if (k == most) return 0;
        at[i] = k;
        if (k == n) v[n++] = q->v[i];
    }
    *m = n;
    memset(row, 0, 3 * (size_t)n * sizeof(double));
    for (i = q->first; i < q->end; i++)
        for (k = 0; k < 3; k++) row[3 * at[i] + k] = q->at.force * q->at.w[i] * q->at.normal[k];
    return 1;
}

/* What couples the contacts q [n] of one key: (p - 1)/E times (sum r^(p-2) g g' - G G'), g = de/dx,
 * r = e/E, G = dE/dx. Without it a vertex in a fold goes to and fro between two faces. */
static cloth_status clothi_group_hessian(const clothi_contact *q, int n, double E,
                                         cloth_matrix *A) {
    double H[9 * CLOTHI_GROUP * CLOTHI_GROUP], G[3 * CLOTHI_GROUP], row[3 * CLOTHI_GROUP];
    int    v[CLOTHI_GROUP], m = 0, loud = 0, i, j, k;
    for (i = 0; i < n; i++) loud += clothi_group_row(q + i, E, CLOTHI_GROUP, v, &m, row);
    if (loud < 2) return CLOTH_OK;
    memset(H, 0, 9 * (size_t)(m * m) * sizeof(double));
    memset(G, 0, 3 * (size_t)m * sizeof(double));
    for (i = 0; i < n; i++) {
        const double r = q[i].at.energy / E, r2 = r * r, r6 = r2 * r2 * r2;
        if (!clothi_group_row(q + i, E, m, v, &m, row)) continue;
        for (j = 0; j < 3 * m; j++) {
            for (k = 0; k < 3 * (j / 3 + 1); k++) H[3 * m * j + k] += 7 / E * r6 * row[j] * row[k];
            G[j] += r6 * r * row[j];
        }
    }
    for (j = 0; j < 3 * m; j++)
        for (k = 0; k < 3 * (j / 3 + 1); k++) H[3 * m * j + k] -= 7 / E * G[j] * G[k];
    return cloth_matrix_add_element(A, m, v, H);
}

/* cloth_contact.eval: outside a step there is nothing, E_col belongs to the motion from x^n. */
static cloth_status clothi_contact_eval(void *user, const cloth_eval *e, double *energy) {
    cloth_collide *c = (cloth_collide *)user;
    cloth_status   status = CLOTH_OK;
    int            i, j, k, l, m;
    *energy = 0;
    if (!c->begun || !(e->h > 0)) return CLOTH_OK;
    clothi_contact_frames(c, e->x);
    status = clothi_hold_eval(c, e, energy);
    for (i = 0; i < c->ncontact && !status; i = j) {
        double E;
        j = clothi_group_end(c, i);
        *energy += E = clothi_contact_group(c->contact + i, j - i);
        if (e->hess && j - i > 1 && E > 0)
            status = clothi_group_hessian(c->contact + i, j - i, E, e->hess);
        for (m = i; m < j && !status; m++) {
            const clothi_contact *q = c->contact + m;
            const clothi_frame   *f = &q->at;
            double                K[9], tangent[3] = {0, 0, 0};
            const double          push = f->part * f->force + f->own[1];
            *energy += f->own[0];
            for (l = q->first; e->grad && push > 0 && l < q->end; l++)
                for (k = 0; k < 3; k++)
                    e->grad[3 * q->v[l] + k] -= f->w[l] * push * f->normal[k];
            if (q->limit > 0) *energy += clothi_contact_friction(c, q, e->x, tangent, K);
            for (l = q->first; e->grad && q->limit > 0 && l < q->end; l++)
                for (k = 0; k < 3; k++) e->grad[3 * q->v[l] + k] += q->w[l] * tangent[k];
            if (e->hess && (push > 0 || q->limit > 0 || q->spring > 0))
                status = clothi_contact_hessian(c, q, e->x, q->limit > 0 ? K : NULL, e->hess);
        }
    }
    return status;
}

/* --- who is a contact --- */

/* The side is that on which the normal lies of the faces around the first vertex, at x^n: within a
 * substep a pair has one key. */
static clothi_key clothi_key_of(const cloth_collide *c, const clothi_contact *q) {
    clothi_key key;
    double     x[12], w[4], n[3] = {0, 0, 0}, face[3], side = 0;
    const int  ee = q->kind == CLOTHI_EE, *v = q->v;
    int        i;
    memset(&key, 0, sizeof key);
    key.feature = ee, key.a = q->a, key.b = q->slot;
    if (v[0] >= c->nv) key.feature = ee ? 1 : 2, key.a = q->b;  /* the cloth's edge or face */
    if (q->slot >= 0) return key;
    clothi_pair_points(c, c->xa, v, 4, x);
    (void)clothi_pair_distance(q->kind, x, w);
    for (i = 0; i < 12; i++) n[i % 3] += w[i / 3] * x[i];
    for (i = c->star[v[0]]; i < c->star[v[0] + 1]; i++) {
        clothi_face_cross(c->xa, c->faces + 3 * c->star_face[i], face);
        side += clothi_dot3(face, n);
    }
    key.cloth = 1, key.b = 2 * c->vertex_part[v[ee ? 2 : 1]] + (side < 0);
    return key;
}

/* The area that a pair stands for, m^2: that of its smaller half, vertex, edge or face; spheres and
 * capsules have none. Cloth meets cloth from both sides: half. Pairs near in the template stand for
 * a vertex of the mean: slivers press with the forces of their neighbours. */
static double clothi_contact_area(const cloth_collide *c, const clothi_contact *q) {
    const double *area = c->area;
    const int    *v = q->v;
    double        a = area[v[0]], b;
    if (q->beside) return 0.5 * c->mean_area;
    if (q->kind == CLOTHI_VP) return a > 0 ? a : c->mean_area;      /* no face has it */
    if (q->kind == CLOTHI_EE) a = (a + area[v[1]]) / 6, b = (area[v[2]] + area[v[3]]) / 6;
    else b = (area[v[1]] + area[v[2]] + area[v[3]]) / 6;    /* 3 edges, 6 faces a vertex */
    return (q->slot < 0 ? 0.5 : 1) * (a > 0 && (a < b || !(b > 0)) ? a : b);
}

/* The coefficients mu [2] of a pair's sides, of which its own is the geometric mean, and where they
 * are in [1 + nobstacle + nparts]; returns how many: a part without one of its own has
 * desc.friction against cloth and leaves the word to obstacles. */
static int clothi_pair_friction(const cloth_collide *c, const clothi_contact *q, int *at,
                                double *mu) {
    int i, n = 0;
    for (i = 0; i < 2; i++) {
        const int    v = q->v[i && q->kind == CLOTHI_EE ? 2 : i], slot = c->slot[v];
        const int    part = slot < 0 && c->part ? c->vertex_part[v] : -1;
        const double own = part < 0 ? 0 : c->part[part].friction;
        if (slot < 0 && q->slot >= 0 && !(own > 0)) continue;
        at[n] = slot >= 0 ? 1 + slot : own > 0 ? 1 + c->nobstacle + part : 0;
        mu[n++] = slot >= 0 ? c->obstacle[slot].friction : own > 0 ? own : c->desc.friction;
    }
    return n;
}

/* Gap where the force of a pair has no bound, m: d_min. What begins nearer has it a little below,
 * to stay where it is under load; far below in a substep in which bodies squeeze it too much. */
static double clothi_pair_pole(const cloth_collide *c, double t, double start) {
    return clothi_min(CLOTHI_POLE * t, c->approach * start);
}

/* --- the list --- */

/* The contacts from i on, by Shell's sort of their numbers, take their places among those before
 * them, from the last one on: by key, then by features. */
static cloth_status clothi_contact_sort(cloth_collide *c, int i) {
    clothi_contact *t = c->contact;
    int            *order, j = c->ncontact - i, gap, k, l;
    cloth_status    status = CLOTHI_ROOM(c, order, j);
    c->framed = 0;
    if (!status) status = CLOTHI_ROOM(c, spare, j);
    if (status) return status;
    for (order = c->order, k = 0; k < j; k++) order[k] = i + k;
    for (gap = j / 2; gap > 0; gap = gap == 2 ? 1 : (int)(gap * 0.45))
        for (k = gap; k < j; k++) {
            const int q = order[k];
            for (l = k; l >= gap && clothi_order(t + q, t + order[l - gap], 7) < 0; l -= gap)
                order[l] = order[l - gap];
            order[l] = q;
        }
    for (k = 0; k < j; k++) c->spare[k] = t[order[k]];
    for (k = c->ncontact - 1; j > 0; k--) {
        const int old = i > 0 && clothi_order(t + i - 1, c->spare + j - 1, 7) > 0;
        t[k] = old ? t[--i] : c->spare[--j];
    }
    return CLOTH_OK;
}

/* The anchor of a key in a list [n] of them, or NULL. */
static clothi_anchor *clothi_anchor_of(clothi_anchor *list, int n, const clothi_key *key) {
    int there, at = clothi_find(list, sizeof *list, n, key, 4, &there);
    return there ? list + at : NULL;
}

/* Contact q of a pair, without more than its sides. */
static void clothi_contact_of(const cloth_collide *c, const clothi_pair_id *p, clothi_contact *q) {
    memset(q, 0, sizeof *q);
    q->kind = p->kind, q->a = p->a, q->b = p->b;
    q->slot = clothi_pair_slot(c, p);
    q->radius = clothi_slot_radius(c, q->slot);
    q->n = clothi_pair_vertices(c, p, q->v);
    while (q->v[q->first] >= c->nv) q->first++;
    for (q->end = q->first; q->end < q->n && q->v[q->end] < c->nv;) q->end++;
}

/* Fills contact q of a pair, cloth at x, obstacles where they end, with what its anchor remembers;
 * 0: it is none. */
static int clothi_contact_new(const cloth_collide *c, const clothi_pair_id *p, const double *x,
                              clothi_contact *q) {
    const clothi_anchor *anchor;
    clothi_frame         first;             /* at x^n */
    double               left, mu[2];
    int                  at[2];
    clothi_contact_of(c, p, q);
    q->range = clothi_pair_thickness(c, p, q->v);
    q->beside = q->slot < 0 && q->range < c->desc.thickness;
    if (q->kind == CLOTHI_VP) {
        q->w[0] = 1, q->w[1] = -1;
        memcpy(q->normal, c->obstacle[q->b].normal, sizeof q->normal);
    }
    if (clothi_is_soft(c, p) && !clothi_contact_soft(c, q, x)) return 0;
    clothi_contact_frame_at(c, q, x, &q->at);
    if (!q->soft) {
        clothi_contact_frame_at(c, q, c->xa, &first);
        q->start = first.gap;
        q->share = clothi_contact_share(c, q, &first);
        q->room = q->range - clothi_pair_pole(c, q->range, q->start);
        if (!(q->at.gap > q->range - q->room && q->start > 0)) return 0;
        memcpy(q->w, q->at.w, sizeof q->w);
        memcpy(q->normal, q->at.normal, sizeof q->normal);
    }
    q->stiffness = c->stiffness * clothi_contact_area(c, q);
    if (q->slot < 0) q->stiffness *= c->desc.thickness / q->range;
    q->friction = clothi_pair_friction(c, q, at, mu) < 2 ? mu[0] : sqrt(mu[0] * mu[1]);
    q->key = clothi_key_of(c, q);
    q->size = -1, q->scale = 1;
    anchor = clothi_anchor_of(c->next, c->nnext, &q->key);
    if (anchor) {
        q->start = clothi_min(q->start, anchor->gap);
        memcpy(q->slip, anchor->slip, sizeof q->slip);
    }
    q->away = clothi_contact_away(c, q);
    left = clothi_max(q->range - q->start - q->away, 0);        /* of what is damped */
    q->base = clothi_elastic_energy(q, q->range - q->away) +
              0.5 * clothi_contact_damping(c, q) * left * left;
    clothi_contact_renew(c, q, x);
    clothi_contact_normal(c, q, 1, &q->at);
    return 1;
}

#define CLOTHI_ROUND   0.05                 /* of all friction: change that asks for more      */
#define CLOTHI_SETTLED 0.2                  /* of that, of a vertex's friction: residual left  */
#define CLOTHI_FAINT   1e-3                 /* of the tolerance: what moves less does not count */

/* How well friction is known where a search ends, in parts of itself: as the tolerance is in t. */
static double clothi_friction_error(const cloth_collide *c) {
    return clothi_max(CLOTHI_ROUND, c->sim->model->desc.tolerance / c->desc.thickness);
}

/* N: less friction of a contact moves its cloth by less than a thousandth of the tolerance. */
static double clothi_friction_faint(const cloth_collide *c, const clothi_contact *q) {
    double m = 0;
    int    i;
    for (i = q->first; i < q->end; i++) m += fabs(q->w[i]) * c->sim->params.mass[q->v[i]];
    return CLOTHI_FAINT * m * c->sim->model->desc.tolerance / (c->h * c->h);
}

/* Whether what is left of the balance, residual [nv x 3] N, is little beside friction where half of
 * it acts: a tolerance in metres says little of a force. Not all of it: slivers of a mesh hold more
 * than all contacts, and yield last. */
static int clothi_contact_settled(cloth_collide *c, const double *residual) {
    const double part = CLOTHI_SETTLED * clothi_friction_error(c);
    double      *limit = c->qp_x, settled = 0, all = 0; /* [nv] N */
    int          i, j;
    memset(limit, 0, (size_t)c->nv * sizeof(double));
    for (i = 0; i < c->ncontact; i++) {
        const clothi_contact *q = c->contact + i;
        if (!(q->limit > clothi_friction_faint(c, q))) continue;
        for (j = q->first; j < q->end; j++) limit[q->v[j]] += fabs(q->w[j]) * q->limit;
    }
    for (i = 0; i < c->nv; i++) {
        const double *r = residual + 3 * i, most = part * limit[i];
        all += limit[i];
        settled += clothi_dot3(r, r) <= most * most ? limit[i] : 0;
    }
    return settled >= 0.5 * all;
}

/* Normal forces. start: limits of friction are those of the step before, on the contacts that a key
 * has now, as their forces are, on the nearest one where none has any. follow, 0 to 1: so far they
 * go to those of these forces; returns by how much they change, in parts of all. */
static double clothi_contact_limits(cloth_collide *c, double follow, int start) {
    double change = 0, all = 0, more;
    int    i, j, k;
    for (i = 0; i < c->ncontact; i = j) {
        clothi_contact      *q = c->contact;
        const clothi_anchor *a = start ? clothi_anchor_of(c->next, c->nnext, &q[i].key) : NULL;
        double               sum = 0;
        int                  least = i;
        j = clothi_group_end(c, i);
        (void)clothi_contact_group(q + i, j - i);
        for (k = i; k < j; k++) {
            sum += q[k].force = q[k].at.part * q[k].at.force + q[k].at.own[1];
            if (q[k].gap < q[least].gap) least = k;
            if (!(follow > 0)) continue;
            more = follow * (q[k].friction * q[k].force - q[k].limit);
            q[k].limit += more;
            if (!(q[k].limit + fabs(more) > clothi_friction_faint(c, q + k))) continue;
            change += fabs(more);
            all += q[k].limit;
        }
        for (k = i; k < j && start; k++)
            q[k].limit = (a ? q[k].friction * a->force : 0) *
                         (sum > 0 ? q[k].force / sum : k == least);
    }
    return all > 0 ? change / all : change > 0;
}

/* --- moves from a feasible point ---
 *
 * From there on every move of the cloth is cut where a pair would come near its pole. The broad
 * phase is made for a segment and some slack around it and serves while the iterates stay there;
 * a vertex that leaves has its pairs sought anew. Of each pair a bound of the way to its range is
 * known, exact when last looked at, less by what its sides have gone since: mostly one comparison.
 * What may come into range on a move is a contact. */

#define CLOTHI_LIST_SLACK 0.5               /* t, around the segment that a list is made for   */
#define CLOTHI_LEAVE      8                 /* of cloth: where more leaves, the list is new     */
#define CLOTHI_REACH      0.1               /* t: how much farther than in range is a contact  */
#define CLOTHI_MOVE       0.9               /* of the way to where a pair is at d_min          */
#define CLOTHI_LEAP       4                 /* mean edges of cloth, most of a move's axes      */
#define CLOTHI_HIT_GRAIN  256               /* pairs a range                                   */

enum { CLOTHI_HIT_CONTACT = 1, CLOTHI_HIT_EXEMPT = 2 };  /* of a list                          */

/* The part of d [3] (NULL: none) from p [3] on which vertex i of cloth stays t/2 inside of its box.
 * Negative: not even at p. */
static double clothi_box_covers(const cloth_collide *c, int i, const double *p, const double *d) {
    const double t = 0.5 * c->thickest;
    double       part = 1;
    int          k;
    for (k = 0; k < 3; k++) {
        const double *box = c->box_v + 6 * i + k, go = d ? d[k] : 0;
        const double  low = p[k] - t - box[0], high = box[3] - t - p[k];
        if (low < 0 || high < 0) return -1;
        if (part * go > high) part = high / go;
        else if (-part * go > low) part = -low / go;
    }
    return part;
}

/* The same of all vertices: so far the list is whole. */
static double clothi_list_covers(const cloth_collide *c, const double *x, const double *dx) {
    const int n = clothi_only_walls(c) ? 0 : c->nv;
    double    part = c->listed ? 1 : -1;
    int       i;
    for (i = 0; i < n && !(part < 0); i++)
        part = clothi_min(part, clothi_box_covers(c, i, x + 3 * i, dx ? dx + 3 * i : NULL));
    return part;
}

/* The contact thickness of a pair of the list and the gap that it is felt from, worked out once:
 * what has no share begins where its guard does. */
static void clothi_near_range(const cloth_collide *c, clothi_near *p) {
    clothi_contact q;
    clothi_frame   f;
    if (p->thick > 0) return;
    clothi_contact_of(c, &p->id, &q);
    p->felt = p->thick = q.range = clothi_pair_thickness(c, &p->id, q.v);
    if (q.kind == CLOTHI_VP || (q.kind == CLOTHI_VF && q.a < c->nv)) return;
    clothi_contact_frame_at(c, &q, c->xa, &f);
    if (!(clothi_contact_share(c, &q, &f) > 0))
        p->felt *= 1 - (1 - CLOTHI_GUARD) * (1 - CLOTHI_POLE);
}

/* How far a pair is from where it is felt, m, or less; cloth at x, that of c->gone, obstacles where
 * they end. */
static double clothi_near_slack(const cloth_collide *c, clothi_near *p, const double *x) {
    double left = -HUGE_VAL;
    if (!clothi_is_soft(c, &p->id)) {
        const double gap = clothi_pair_gap(c, x, &p->id);
        left = gap - clothi_slot_thickness(c, clothi_pair_slot(c, &p->id));
        if (!(left > CLOTHI_REACH * c->thickest)) clothi_near_range(c, p), left = gap - p->felt;
    }
    p->slack = left + clothi_pair_far(c, c->gone, &p->id);
    return left;
}

static void clothi_slack_range(int begin, int end, int worker, void *ctx) {
    cloth_collide *c = (cloth_collide *)ctx;
    int            i;
    (void)worker;
    for (i = begin; i < end; i++) (void)clothi_near_slack(c, c->pair + i, c->x_list);
}

/* Of the pairs from `first` on those stay that have moved, or have not; all with walls. */
static void clothi_list_cut(cloth_collide *c, int first, int moved) {
    int i, n = first;
    for (i = first; i < c->npair; i++) {
        const clothi_near *p = c->pair + i;
        if (p->id.kind == CLOTHI_VP ||
            clothi_pair_moved(c, p->id.kind, p->id.a, p->id.b) == moved)
            c->pair[n++] = *p;
    }
    c->npair = n;
}

/* Contacts stay with what is lagged where their pair has not moved, or is among those of the list
 * from `first` on and near, or with a grid. */
static cloth_status clothi_list_keep(cloth_collide *c, int first) {
    const double    reach = CLOTHI_REACH * c->thickest;
    clothi_contact *q = c->contact, of;
    int             n = 0, i, at, there;
    if (c->ncontact == 0) return CLOTH_OK;
    if (CLOTHI_ROOM(c, order, c->ncontact)) return CLOTH_ERR_MEMORY;
    for (i = 0; i < c->ncontact; i++)
        c->order[i] = first && (q[i].kind == CLOTHI_VP ||
                                 !clothi_pair_moved(c, q[i].kind, q[i].a, q[i].b));
    for (i = first; i < c->npair; i++) {
        clothi_near *p = c->pair + i;
        if (p->slack - clothi_pair_far(c, c->gone, &p->id) > reach) continue;
        clothi_contact_of(c, &p->id, &of);
        of.key = clothi_key_of(c, &of);
        at = clothi_find(q, sizeof of, c->ncontact, &of, 7, &there);
        if (there && !(clothi_near_slack(c, p, c->x_list) > reach))
            c->order[at] = p->hit = CLOTHI_HIT_CONTACT;
    }
    for (i = 0; i < c->ncontact; n += c->order[i++])
        if (c->order[i] && n < i) q[n] = q[i];
    c->ncontact = n;
    c->framed = 0;
    return CLOTH_OK;
}

/* The iterate is x, inside of the list. */
static void clothi_list_drift(cloth_collide *c, const double *x) {
    const int n = 3 * c->nv;
    double   *dx = c->qp_x;
    int       i;
    if (memcmp(c->x_list, x, (size_t)n * sizeof(double)) == 0) return;
    for (i = 0; i < n; i++) dx[i] = x[i] - c->x_list[i];
    clothi_move_far(c, dx);
    memcpy(c->gone, c->travel, (size_t)(c->nw + c->me + c->mf) * sizeof(double));
    memcpy(c->x_list, x, (size_t)n * sizeof(double));
}

/* Pairs for segments near that from x to y, of walls all; contacts as they were. Of a list that is
 * there only those of vertices that leave their boxes, mostly one of thousands, are made anew. */
static cloth_status clothi_list_make(cloth_collide *c, const double *x, const double *y) {
    const double reach = (1 + 2 * CLOTHI_LIST_SLACK) * c->thickest;
    cloth_status status;
    double       d[3];
    int          first = 0, leave = 0, i;
    for (i = 0; i < c->nv && c->listed; i++) {
        clothi_sub3(y + 3 * i, x + 3 * i, d);
        leave += c->moved[i] = clothi_box_covers(c, i, x + 3 * i, d) < 1;
    }
    if (!c->listed || leave > c->nv / CLOTHI_LEAVE) {
        memset(c->moved, 1, (size_t)c->nv);
        status = clothi_broad_phase(c, x, y, CLOTHI_ENDED, reach, 0);
        memcpy(c->x_list, x, 3 * (size_t)c->nv * sizeof(double));
        memset(c->gone, 0, (size_t)(c->nw + c->me + c->mf) * sizeof(double));
        clothi_for(c->hooks, c->npair, CLOTHI_HIT_GRAIN, clothi_slack_range, c);
    } else {
        clothi_list_drift(c, x);
        clothi_move_features(c);
        for (i = 0; i < c->nv; i++)
            if (c->moved[i])
                clothi_swept_boxes(1, x + 3 * i, y + 3 * i, 0.5 * reach, c->box_v + 6 * i);
        clothi_face_boxes(c->nf, c->faces, c->box_v, c->box_f);
        clothi_bvh_refit(c->hooks, &c->tree, c->box_f);
        clothi_list_cut(c, 0, 0);
        first = c->npair;
        status = clothi_all_round(c);
        if (!status) status = clothi_tree_phase(c, &c->solid, CLOTHI_MOVED);
        if (!status && c->self) status = clothi_tree_phase(c, &c->tree, CLOTHI_MOVED);
        clothi_list_cut(c, first, 1);       /* faces that moved have features that have not */
        clothi_slack_range(first, c->npair, 0, c);
    }
    c->listed = 1;
    return status ? status : clothi_list_keep(c, first);
}

/* The part of the way from c->at along c->way that a pair of the list leaves free: its time. */
static void clothi_near_free(const cloth_collide *c, clothi_near *q) {
    const clothi_pair_id *p = &q->id;
    const double gone = clothi_pair_far(c, c->gone, p);
    double       x[12], y[12], come, gap, least, fall;
    int          v[4], k;
    if (q->slack - clothi_pair_far(c, c->travel, p) > 0) return;
    come = clothi_pair_come(c, p, c->way);
    if (!(come > 0) || q->slack - gone - come > 0) return;
    clothi_near_range(c, q);
    gap = clothi_pair_gap(c, c->at, p);
    q->slack = gap - q->felt + gone;
    if (gap - come > CLOTHI_SEPARATION * q->thick || clothi_is_soft(c, p) || clothi_is_exempt(c, p))
        return;
    least = clothi_pair_pole(c, q->thick, clothi_pair_gap(c, c->xa, p));
    least = gap > least ? least + 0.1 * (gap - least) : 0.5 * gap;      /* 9/10 of the way */
    if (p->kind == CLOTHI_VP) {
        fall = -clothi_dot3(c->way + 3 * p->a, c->obstacle[p->b].normal);
        if (fall > 0 && !(gap - fall > CLOTHI_SEPARATION * q->thick))
            q->time = clothi_max((gap - least) / fall, 0);
        return;
    }
    (void)clothi_pair_vertices(c, p, v);
    clothi_pair_points(c, c->at, v, 4, x);
    for (k = 0; k < 12; k++)
        y[k] = x[k] + (v[k / 3] < c->nv ? c->way[3 * v[k / 3] + k % 3] : 0);
    least += clothi_slot_radius(c, clothi_pair_slot(c, p));
    (void)clothi_ccd_pair(p->kind == CLOTHI_EE, x, y, least, &q->time);
}

typedef struct clothi_joining {             /* who becomes a contact                           */
    cloth_collide *c;
    const double  *x, *dx;                  /* [nv x 3] m; dx NULL: no move                    */
    double         part, reach;             /* of dx; m                                        */
    int            n, first;                /* picked, in c->order; of the new contacts        */
} clothi_joining;

/* Of a block of pairs those that dx may bring within reach, with their times, into its part of
 * `order`; behind all of these, where they end there and which has the least time. */
static void clothi_pick_range(int begin, int end, int worker, void *ctx) {
    const clothi_joining *q = (const clothi_joining *)ctx;
    cloth_collide        *c = q->c;
    const double         *ways = q->dx ? c->travel : c->gone;
    int                   b, i, n;
    (void)worker;
    for (b = begin; b < end; b++) {
        const int first = b * CLOTHI_HIT_GRAIN, stop = first + CLOTHI_HIT_GRAIN;
        int      *last = c->order + c->npair + 2 * b;
        for (n = first, i = first; i < stop && i < c->npair; i++) {
            clothi_near *p = c->pair + i;
            if (p->slack - clothi_pair_far(c, ways, &p->id) > q->reach ||
                p->hit == CLOTHI_HIT_EXEMPT)
                continue;
            c->order[n++] = i;
            p->time = 1;
            if (q->dx) clothi_near_free(c, p);
            if (n == first + 1 || p->time < c->pair[last[1]].time) last[1] = i;
        }
        last[0] = n;
    }
}

/* *least: the part of dx that all leave free. */
static cloth_status clothi_list_pick(clothi_joining *q, double *least) {
    cloth_collide *c = q->c;
    const int      blocks = (c->npair + CLOTHI_HIT_GRAIN - 1) / CLOTHI_HIT_GRAIN;
    cloth_status   status = CLOTHI_ROOM(c, order, c->npair + 2 * blocks);
    int            b, i;
    if (status) return status;
    clothi_for(c->hooks, blocks, 1, clothi_pick_range, q);
    for (*least = 1, q->n = 0, b = 0; b < blocks; b++) {
        const int *last = c->order + c->npair + 2 * b, first = b * CLOTHI_HIT_GRAIN;
        if (last[0] > first) *least = clothi_min(*least, c->pair[last[1]].time);
        for (i = first; i < last[0]; i++) c->order[q->n++] = c->order[i];
    }
    return CLOTH_OK;
}

/* Whether a pair that was picked comes within reach on the part of dx. */
static int clothi_joins(const clothi_joining *q, clothi_near *p) {
    const cloth_collide *c = q->c;
    const double         reach = q->reach + clothi_pair_far(c, c->gone, &p->id) +
                         (q->dx ? q->part * clothi_pair_come(c, &p->id, q->dx) : 0);
    if (p->hit) return 0;
    if (!(p->time < 1 || p->slack > reach)) (void)clothi_near_slack(c, p, q->x);
    if (!(p->time < 1) && p->slack > reach) return 0;
    p->hit = clothi_is_exempt(c, &p->id) ? CLOTHI_HIT_EXEMPT : 0;
    return !p->hit;
}

static void clothi_join_range(int begin, int end, int worker, void *ctx) {
    const clothi_joining *q = (const clothi_joining *)ctx;
    int                  *order = q->c->order, i;
    (void)worker;
    for (i = begin; i < end; i++)
        if (!clothi_joins(q, q->c->pair + order[i])) order[i] = -1;
}

static void clothi_new_range(int begin, int end, int worker, void *ctx) {
    const clothi_joining *q = (const clothi_joining *)ctx;
    cloth_collide        *c = q->c;
    int                   i;
    (void)worker;
    for (i = begin; i < end; i++) {
        clothi_near *p = c->pair + c->order[i];
        p->hit = clothi_contact_new(c, &p->id, q->x, c->contact + q->first + i);    /* _CONTACT */
    }
}

/* What was picked and comes within range, and `reach`, on the way from x to x + part dx becomes
 * contacts. */
static cloth_status clothi_list_join(clothi_joining *q) {
    cloth_collide *c = q->c;
    cloth_status   status;
    int            i, n = 0;
    q->first = c->ncontact;
    clothi_for(c->hooks, q->n, CLOTHI_HIT_GRAIN, clothi_join_range, q);
    for (i = 0; i < q->n; i++)
        if (c->order[i] >= 0) c->order[n++] = c->order[i];
    status = CLOTHI_ROOM(c, contact, c->ncontact + n);
    if (status) return status;
    clothi_for(c->hooks, n, CLOTHI_CONTACT_GRAIN, clothi_new_range, q);
    for (i = 0; i < n; i++) {
        const int to = c->ncontact, from = q->first + i;
        if (to < from) c->contact[to] = c->contact[from];
        c->ncontact += c->pair[c->order[i]].hit;
    }
    return c->ncontact == q->first ? CLOTH_OK : clothi_contact_sort(c, q->first);
}

/* What is within range at x becomes contacts. */
static cloth_status clothi_list_at(cloth_collide *c, const double *x) {
    clothi_joining q = {c, x, NULL, 0, 0, 0, 0};
    double         least;
    cloth_status   status = CLOTH_OK;
    if (clothi_list_covers(c, x, NULL) < 0) status = clothi_list_make(c, x, x);
    else clothi_list_drift(c, x);
    if (!status) status = clothi_list_pick(&q, &least);
    return status ? status : clothi_list_join(&q);
}

/* The force of each contact that the matrix foretells for dx. */
static void clothi_aim_range(int begin, int end, int worker, void *ctx) {
    const clothi_joining *job = (const clothi_joining *)ctx;
    int                   i, j;
    (void)worker;
    for (i = begin; i < end; i++) {
        clothi_contact *q = job->c->contact + i;
        q->aim = q->at.force + q->at.own[1];
        for (j = q->first; j < q->end; j++)
            q->aim -= (q->at.slope + q->at.own[2] + q->spring) * q->at.w[j] *
                      clothi_dot3(q->at.normal, job->dx + 3 * q->v[j]);
    }
}

/* cloth_contact.max_step. */
static cloth_status clothi_contact_max_step(void *user, const double *x, const double *dx,
                                            double *part) {
    cloth_collide *c = (cloth_collide *)user;
    clothi_joining q = {c, x, c->way, 1, CLOTHI_REACH * c->thickest, 0, 0};
    double         covers, least, most = CLOTHI_LEAP * c->length, *y = c->qp_x0;
    cloth_status   status;
    int            i, made = 0;
    most /= clothi_max(clothi_max_abs(dx, 3 * c->nv), most);
    clothi_list_drift(c, x);
    for (;;) {
        for (i = 0; i < 3 * c->nv; i++) y[i] = x[i] + most * dx[i], c->way[i] = y[i] - x[i];
        covers = clothi_list_covers(c, x, c->way);
        for (i = 0; i < 3 * c->nv; i++) c->way[i] *= clothi_max(covers, 0);
        c->at = x;
        clothi_move_far(c, c->way);
        status = clothi_list_pick(&q, &least);
        if (status) return status;
        if (least < 1 || !(covers < 1) || made++) break;
        status = clothi_list_make(c, x, y);     /* nothing stops it before the list ends */
        if (status) return status;
    }
    q.part = least < 1 ? CLOTHI_MOVE * least : 1;
    *part = most * covers * q.part;
    status = clothi_list_join(&q);
    q.dx = dx;                              /* all of it */
    clothi_for(c->hooks, c->ncontact, CLOTHI_CONTACT_GRAIN, clothi_aim_range, &q);
    return status;
}

/* Stiffness by which a contact's force would grow from here to q->aim, less its slope; N/m. */
static double clothi_contact_secant(const cloth_collide *c, const clothi_contact *q) {
    double       low = 0, high = clothi_min(q->gap - (q->range - q->room), c->length);
    clothi_frame f = q->at;
    const double force = f.force + f.own[1], slope = f.slope + f.own[2];
    int          i;
    if (!(q->aim > force)) return 0;
    for (i = 0; i < 20; i++) {
        const double a = 0.5 * (low + high);
        f.gap = q->gap - a;
        clothi_contact_normal(c, q, 0, &f);
        if (f.force + f.own[1] < q->aim) low = a;
        else high = a;
    }
    return clothi_max((q->aim - force) / high - slope, 0);
}

static void clothi_renew_range(int begin, int end, int worker, void *ctx) {
    cloth_collide *c = (cloth_collide *)ctx;
    int            i;
    (void)worker;
    for (i = begin; i < end; i++) {
        clothi_contact_renew(c, c->contact + i, c->x_frame);
        c->contact[i].spring = clothi_contact_secant(c, c->contact + i);
    }
}

/* cloth_contact.update. A minimiser for some limits of friction ends a round: they follow the
 * normal forces there, and it is the last one where they hardly change. */
static cloth_status clothi_contact_update(void *user, const double *x, const double *residual,
                                          int *done) {
    cloth_collide *c = (cloth_collide *)user;
    cloth_status   status = CLOTH_OK;
    double         change;
    int            settled;
    if (!residual || clothi_list_covers(c, x, NULL) < 0)    /* else it has joined on the move   */
        status = clothi_list_at(c, x);
    clothi_contact_frames(c, x);
    settled = residual && clothi_contact_settled(c, residual);
    if (!residual) c->iterates = c->renewed = 0;
    c->iterates++;
    c->renewed += settled;
    clothi_for(c->hooks, c->ncontact, CLOTHI_CONTACT_GRAIN, clothi_renew_range, c);
    change = clothi_contact_limits(c, settled ? clothi_friction_follow(c->renewed) : 0,
                                   !c->renewed);
    if (done) *done = *done && settled && change <= clothi_friction_error(c);
    return status;
}

/* ===== [8.3] PINCHES =========================================================================
 *
 *    one part |  cloth  | the other     Where two parts of one body come nearer than cloth has room
 *             |         |               for, or pass each other, cloth between them cannot be free.
 *          A0 + -> n0   |               It is dragged along: a vertex p that is caught passes the
 *             |    p    |               body and is pulled to where a point A0 of one part and A1
 *             |   n1 <- + A1            of the other, carried by their faces, take it     [BWK03]
 *
 *   caught   A0 is the nearest point of those faces that p is outside of, A1 the nearest of them
 *            with p between, the angle from p - A0 to p - A1 more than 107 degrees. |A1 - A0| is
 *            less than 2 t, or, when the substep ends, along m = (n0 - n1)/|n0 - n1|. Not of
 *            vertices but where a finger presses the inside of a face: only if the step failed else
 *            [8.4]; what the finger is through then stays on it till it leaves by its end
 *   kept     by the winding number of p at x^n [7.1]. 0: while it would be caught with 3 t for 2,
 *            between the points so found. 1: the part that it is in has passed it. It goes where
 *            its motion takes it, y = x^n + h v^n of an implicit step, as cloth around it does; if
 *            that is inside when the substep ends, to above what is nearest to y then. Deeper than
 *            3 t, or where that looks the other way, to above that of its points which it is
 *            behind: out by the side that it came in by.
 *            Else, where another part is above that or where parts overlap, both points slide from
 *            face to face, of those that look at the other one, nearest to p.
 *            p is to go the mean of the points' ways w0, w1, and along m (1 - s) w0 + s w1, with
 *            the share s of the way from A0 to A1 that it had when it was caught. Where that
 *            ends inside of one part, as it does behind a wrist that leaves a hip, p is pulled to
 *            above what is nearest with no part above. Minimising begins where it was
 *   let go   a face that still crosses the body, with no vertex held, is pushed out: away from what
 *            is nearest, by t a substep, and no other way. So is an edge across from a vertex that
 *            is held: in a finger, among features that hold it, it could go nowhere
 *
 * A step in which points of a hold pass each other by more than CLOTHI_PASSING t has so many
 * substeps that they do not, of CLOTH_SUBSTEPS_ASKED at most (desc.substeps = 0): cloth between
 * would come out into one of both.
 *
 * The pull is F r (sqrt(1 + d^2/r^2) - 1), d = |x - to|: a spring F/r, of 10 times the membrane's
 * stiffness K, that never pulls harder than F: K t/2 on what is held, 27 K t on what is in one part
 * or goes out, and less of that where an edge beside it is longer at x^n than 1.5 of its length, a
 * twentieth at 2.5.
 * It begins anew at x^n in every substep: a drag. So cloth stays whole; nailed to `to`, as in
 * [BWK03], its edges grew. What was tried for all of this: tests/stability/random_motions.c.
 *
 * Exempt are pairs with the body of which it holds a vertex, where all faces around the body's side
 * are in the pinch: no farther from where that vertex was or is pulled to than cloth hangs on it.
 * The rest of the body holds all cloth, and cloth does not pass cloth. Faces that intersect when
 * the substep ends are listed, and exempt until they part [8.1], but for a vertex that is outside
 * of the body: it may not go in.
 *
 * [BWK03] Baraff, Witkin, Kass: Untangling Cloth, SIGGRAPH 2003.
 * checked: tests/test_pinch.c, test_collide_state.c (the pull) */

#define CLOTHI_FACING   (-0.3)              /* cosine between what is on two sides             */
#define CLOTHI_PINCHED  2                   /* t: less room than that at either pose           */
#define CLOTHI_OPENED   3                   /* t: room at both poses for what is let go        */
#define CLOTHI_WALK     100                 /* faces that a point slides over in a substep     */
#define CLOTHI_DRAG     10                  /* of the membrane's stiffness: what pulls         */
#define CLOTHI_HOLD     0.5                 /* t of that stiffness, N: the most on what is held */
#define CLOTHI_PULL     27                  /* the same: on what goes out                      */
#define CLOTHI_PASSING  5                   /* t: so far points of a hold pass in a substep    */
#define CLOTHI_SHALLOW  3                   /* t: so deep, all goes out where it is nearest    */
#define CLOTHI_DEEP     20                  /* t: no way aside is farther                      */
#define CLOTHI_TAUT     2.5                 /* stretch of an edge beside that leaves of that   */
#define CLOTHI_SLIP     0.05                /* so much                                         */
#define CLOTHI_CATCH_GRAIN 64               /* vertices a range                                */

CLOTHI_RARE_BEGIN

/* Point and normal of side k of a hold in the world's pose x. */
static void clothi_hold_point(const cloth_collide *c, const cloth_hold *h, int k, const double *x,
                              double *point, double *normal) {
    const int *v = c->faces + 3 * (size_t)(c->obstacle[h->slot].f0 + h->face[k]);
    int        i;
    for (i = 0; i < 3; i++)
        point[i] = h->weight[k][0] * x[3 * v[0] + i] + h->weight[k][1] * x[3 * v[1] + i] +
                   h->weight[k][2] * x[3 * v[2] + i];
    clothi_face_normal(x, v, normal);
}

/* Room between both points, m, along m [3]; A [2 x 3], n [2 x 3]. */
static double clothi_hold_room(const cloth_collide *c, const cloth_hold *h, const double *x,
                               double *A, double *n, double *m) {
    double size, d[3];
    int    k;
    for (k = 0; k < 2; k++) clothi_hold_point(c, h, k, x, A + 3 * k, n + 3 * k);
    clothi_sub3(n, n + 3, m);
    size = sqrt(clothi_dot3(m, m));
    for (k = 0; k < 3 && size > 0; k++) m[k] /= size;
    clothi_sub3(A + 3, A, d);
    return clothi_dot3(d, m);
}

/* The faces at x of the bodies that may hold vertex v: what it may not touch, does not. */
static clothi_surface clothi_hold_bodies(const cloth_collide *c, int v, const double *x) {
    const clothi_surface bodies = {x, c->faces, c->dragging, NULL, &c->solid};
    int                  o;
    CLOTHI_OBSTACLES(c, o) {
        const clothi_obstacle *b = c->obstacle + o;
        memset(c->dragging + b->f0, b->self_penetrating && clothi_may_touch(c, v, b->v0),
               (size_t)b->nf);
    }
    return bodies;
}

typedef struct clothi_catch {               /* a search for the nearest face                   */
    const cloth_collide *c;
    int                  slot;
    const double        *x;                 /* the pose                                        */
    const double        *from;              /* of p: unit, from what is to be on its other side */
    const unsigned char *open;              /* NULL: p is to be outside of the face; else none of
                                               these bodies above the point, wherever p is     */
} clothi_catch;

static double clothi_catch_far(int face, const double *p, const void *ctx) {
    const clothi_catch  *q = (const clothi_catch *)ctx;
    const cloth_collide *c = q->c;
    const int           *v = c->faces + 3 * (size_t)face;
    double               w[3], d[3], n[3], d2;
    int                  k, found;
    if (c->slot[v[0]] != q->slot) return HUGE_VAL;
    d2 = clothi_face_distance2(q->x, v, p, w);
    clothi_face_cross(q->x, v, n);
    for (k = 0; k < 3; k++)
        d[k] = p[k] - w[0] * q->x[3 * v[0] + k] - w[1] * q->x[3 * v[1] + k] -
               w[2] * q->x[3 * v[2] + k];
    if (!q->open) {
        found = clothi_dot3(n, d) > 0;
        if (q->from) found &= clothi_dot3(d, q->from) < CLOTHI_FACING * sqrt(d2);
    } else {
        const clothi_surface body = {q->x, c->faces, q->open, NULL, &c->solid};
        const double         up = CLOTHI_GAP * c->obstacle[q->slot].thickness;
        for (k = 0; k < 3; k++) d[k] = p[k] - d[k] + up / sqrt(clothi_dot3(n, n)) * n[k];
        found = clothi_surface_winding(&body, d) == 0;
    }
    return found ? d2 : HUGE_VAL;
}

/* Whether p [3], of cloth at x^n, is between two parts of an obstacle nearer than `room` t at
 * either pose: there a hold of vertex v has its points and its share. */
static int clothi_catch_point(const cloth_collide *c, const double *p, int v, int slot, double room,
                              cloth_hold *h) {
    const double  t = c->obstacle[slot].thickness, way = c->obstacle[slot].way;
    double        A[6], n[6], m[3], from[3], d[3], start;
    clothi_catch  q = {c, slot, c->xa, NULL, NULL};
    int           i, k, f;
    memset(h, 0, sizeof *h);
    h->vertex = v, h->slot = slot;
    for (k = 0; k < 2; k++) {
        double d2 = (room * t + (k + 1) * way) * (room * t + (k + 1) * way);
        f = clothi_bvh_nearest(&c->solid, p, q.from, clothi_catch_far, &q, &d2);
        if (f < 0) return 0;
        (void)clothi_face_distance2(c->xa, c->faces + 3 * f, p, h->weight[k]);
        h->face[k] = f - c->obstacle[slot].f0;
        clothi_hold_point(c, h, k, c->xa, A + 3 * k, n);
        clothi_sub3(p, A + 3 * k, d);
        for (i = 0; i < 3 && k == 0; i++) from[i] = d[i] / sqrt(d2);
        q.from = from;
    }
    clothi_sub3(A + 3, A, m);
    start = sqrt(clothi_dot3(m, m));
    h->share = 1 + clothi_dot3(d, m) / (start * start);
    return clothi_min(start, clothi_hold_room(c, h, c->xb, A, n, m)) < room * t;
}

/* Point k of a hold slides to what is nearest to p around it, at the start of the substep, of faces
 * that look at the other one's. */
static void clothi_hold_slide(const cloth_collide *c, cloth_hold *h, int k, const double *p) {
    const int f0 = c->obstacle[h->slot].f0;
    double    w[3], n[3], facing[3];
    double    least = clothi_face_distance2(c->xa, c->faces + 3 * (f0 + h->face[k]), p,
                                            h->weight[k]);
    int       go, turn, i, j;
    clothi_hold_point(c, h, 1 - k, c->xa, w, facing);
    for (turn = 0, go = 1; go && turn < CLOTHI_WALK; turn++) {
        const int *v = c->faces + 3 * (size_t)(f0 + h->face[k]);
        for (go = 0, i = 0; i < 3; i++)
            for (j = c->star[v[i]]; j < c->star[v[i] + 1]; j++) {
                const int   *f = c->faces + 3 * c->star_face[j];
                const double d2 = clothi_face_distance2(c->xa, f, p, w);
                if (!(d2 < least * (1 - 1e-9))) continue;
                clothi_face_cross(c->xa, f, n);
                if (clothi_dot3(n, facing) > CLOTHI_FACING * sqrt(clothi_dot3(n, n))) continue;
                least = d2, go = 1;
                h->face[k] = c->star_face[j] - f0;
                memcpy(h->weight[k], w, sizeof w);
            }
    }
}

/* Above point 0 of a hold when the substep ends. */
static void clothi_hold_above(const cloth_collide *c, const cloth_hold *h, double *to) {
    double n[3];
    int    k;
    clothi_hold_point(c, h, 0, c->xb, to, n);
    for (k = 0; k < 3; k++) to[k] += CLOTHI_GAP * c->obstacle[h->slot].thickness * n[k];
}

/* Of cloth_collide.look: held between both points, or aside of there; is led away from outside; in
 * one part, goes back to between both points, goes out, or has. */
enum { CLOTHI_LET_GO, CLOTHI_HELD, CLOTHI_ASIDE, CLOTHI_LED, CLOTHI_BACK, CLOTHI_OUT,
       CLOTHI_PASSED };

/* Where a vertex that is held is to go from x^n. */
static void clothi_hold_goal(const cloth_collide *c, const cloth_hold *h, double *to) {
    const double *p = c->xa + 3 * h->vertex;
    double        A[6], B[6], n[6], m[3], d[3], room, along;
    int           k;
    (void)clothi_hold_room(c, h, c->xa, A, n, m);
    room = clothi_hold_room(c, h, c->xb, B, n, m);
    for (k = 0; k < 3; k++) {
        to[k] = p[k] + 0.5 * (B[k] - A[k] + (B[3 + k] - A[3 + k]));
        d[k] = to[k] - B[k];
    }
    along = h->share * room - clothi_dot3(d, m);
    for (k = 0; k < 3; k++) to[k] += along * m[k];
}

/* Point 0 of a hold is what is nearest to p in the pose x, and point 1 too if it was of another
 * body. */
static void clothi_hold_nearest(const cloth_collide *c, const double *x, const double *p,
                                cloth_hold *h) {
    const clothi_surface body = clothi_hold_bodies(c, h->vertex, x);
    double               d2 = CLOTHI_HUGE;
    const int            f = clothi_surface_nearest(&body, p, &d2, h->weight[0]);
    const int            slot = c->slot[c->faces[3 * f]];
    h->face[0] = f - c->obstacle[slot].f0;
    if (slot != h->slot) {
        h->face[1] = h->face[0];
        memcpy(h->weight[1], h->weight[0], sizeof h->weight[0]);
    }
    h->slot = slot;
}

/* Point 0 of *back is that of both of h which p is behind, of two the nearer one, slid to what is
 * nearest to p: the side that p came in by. 0: it is behind neither. */
static int clothi_hold_back(const cloth_collide *c, const cloth_hold *h, cloth_hold *back) {
    const double *p = c->xa + 3 * h->vertex;
    double        least = CLOTHI_HUGE, A[3], n[3], d[3];
    int           k;
    for (k = 0; k < 2; k++) {
        cloth_hold side = *h;
        side.face[0] = h->face[k], side.face[1] = h->face[1 - k];
        memcpy(side.weight[0], h->weight[k], sizeof side.weight[0]);
        memcpy(side.weight[1], h->weight[1 - k], sizeof side.weight[1]);
        if (k) side.share = 1 - h->share;
        clothi_hold_slide(c, &side, 0, p);
        clothi_hold_point(c, &side, 0, c->xa, A, n);
        clothi_sub3(p, A, d);
        if (clothi_dot3(d, n) >= 0 || clothi_dot3(d, d) >= least) continue;
        least = clothi_dot3(d, d);
        *back = side;
    }
    return least < CLOTHI_HUGE;
}

/* Where what is inside of one part is to go: where y is, if that is outside when the substep ends;
 * else to above point 0 of h: what is nearest to y then, or, deeper than CLOTHI_SHALLOW t or where
 * that is another, the side that it came in by; CLOTHI_LET_GO: another part is there. */
static unsigned char clothi_hold_out(const cloth_collide *c, const double *y, cloth_hold *h,
                                     double *to) {
    const clothi_surface body = clothi_hold_bodies(c, h->vertex, c->xb);
    const double         shallow = CLOTHI_SHALLOW * c->obstacle[h->slot].thickness;
    cloth_hold           out[2];
    double               A[3], n[3], B[3], m[3];
    int                  k;
    memcpy(to, y, 3 * sizeof *to);
    if (clothi_surface_winding(&body, y) == 0) return CLOTHI_PASSED;
    out[0] = *h;
    clothi_hold_nearest(c, c->xb, y, out);
    clothi_hold_point(c, out, 0, c->xb, A, n);
    k = clothi_hold_back(c, h, out + 1);
    clothi_hold_point(c, out + k, 0, c->xb, B, m);
    k = k && (clothi_apart2(y, A, 1) > shallow * shallow || clothi_dot3(m, n) < 0);
    clothi_hold_above(c, out + k, to);
    if (clothi_surface_winding(&body, to) != 0) return CLOTHI_LET_GO;
    *h = out[k];
    return CLOTHI_OUT;
}

/* What becomes of a held vertex at x^n; where it goes into `to`. y [3]: where it would go alone. */
static unsigned char clothi_hold_keep(const cloth_collide *c, const double *y, cloth_hold *h,
                                      double *to) {
    const clothi_surface body = clothi_hold_bodies(c, h->vertex, c->xa);
    const double        *p = c->xa + 3 * h->vertex, share = h->share;
    const int            wind = clothi_surface_winding(&body, p);
    unsigned char        look = CLOTHI_LET_GO;
    int                  k;
    if (wind == 1) look = clothi_hold_out(c, y, h, to);
    if (look != CLOTHI_LET_GO) return look;
    if (wind <= 0) {
        if (!clothi_catch_point(c, p, h->vertex, h->slot, CLOTHI_OPENED, h)) return CLOTHI_LET_GO;
        h->share = share;
    }
    for (k = 0; k < 2 && wind > 0; k++) clothi_hold_slide(c, h, k, p);
    clothi_hold_goal(c, h, to);
    return wind == 1 ? CLOTHI_BACK : CLOTHI_HELD;
}

/* Minimising begins where `to` is. What is held and would end inside of one part there is pulled to
 * above what is nearest of where no other part is; its point there is in c->caught. */
static void clothi_hold_aside(cloth_collide *c, const cloth_hold *h) {
    const clothi_surface body = clothi_hold_bodies(c, h->vertex, c->xb);
    const clothi_catch   q = {c, h->slot, c->xb, NULL, body.closed};
    double              *from = c->hold_by + 3 * h->vertex, *to = c->hold_to + 3 * h->vertex;
    double               d2 = CLOTHI_DEEP * c->obstacle[h->slot].thickness;
    cloth_hold          *aside = c->caught + h->vertex;
    int                  f;
    memcpy(from, to, 3 * sizeof *to);
    if (c->look[h->vertex] != CLOTHI_HELD || clothi_surface_winding(&body, from) != 1) return;
    d2 *= d2;
    f = clothi_bvh_nearest(&c->solid, from, NULL, clothi_catch_far, &q, &d2);
    if (f < 0) return;
    *aside = *h;
    aside->face[0] = f - c->obstacle[h->slot].f0;
    (void)clothi_face_distance2(c->xb, c->faces + 3 * f, from, aside->weight[0]);
    clothi_hold_above(c, aside, to);
    c->look[h->vertex] = CLOTHI_ASIDE;
}

/* --- which faces --- */

/* Faces around a held vertex as far as cloth hangs on it are c->pinched: where they begin, around
 * where it was, and where they end, around there and where it is pulled to. */
static void clothi_hold_mark(cloth_collide *c, const cloth_hold *h) {
    const double   *rest = c->sim->model->x_rest, *p = c->xa + 3 * h->vertex;
    const double   *to = c->hold_to + 3 * h->vertex;
    double          reach2 = 0, b[3], reach, box[6];
    clothi_bvh_walk w = {&c->solid, box, 1, 0, 0};
    int             i, k, f;
    for (i = 3 * c->star[h->vertex]; i < 3 * c->star[h->vertex + 1]; i++) {
        const int v = c->faces[3 * c->star_face[i / 3] + i % 3];
        reach2 = clothi_max(reach2, clothi_apart2(rest + 3 * v, rest + 3 * h->vertex, 1));
        reach2 = clothi_max(reach2, clothi_apart2(c->xa + 3 * v, p, 1));
    }
    reach = sqrt(reach2) + c->obstacle[h->slot].thickness, reach2 = reach * reach;
    reach += sqrt(clothi_apart2(to, p, 1));
    clothi_swept_boxes(1, p, NULL, reach, box);
    while ((f = clothi_bvh_next(&w)) >= 0) {
        const int *v = c->faces + 3 * (size_t)f;
        if (c->slot[v[0]] == h->slot && !c->pinched[f])
            c->pinched[f] = clothi_face_distance2(c->xa, v, p, b) < reach2 ||
                            clothi_face_distance2(c->xb, v, p, b) < reach2 ||
                            clothi_face_distance2(c->xb, v, to, b) < reach2;
    }
    for (k = 0; k < 2; k++) c->pinched[c->obstacle[h->slot].f0 + h->face[k]] = 1;
}

/* The hierarchy of the obstacles at both poses, and how far each goes. */
static void clothi_pinch_boxes(cloth_collide *c) {
    int o;
    clothi_tree_boxes(c, &c->solid, c->xa, c->xb, 0);
    c->solid_known = 0;
    CLOTHI_OBSTACLES(c, o) {
        clothi_obstacle *b = c->obstacle + o;
        b->way = sqrt(clothi_apart2(c->xb + 3 * b->v0, c->xa + 3 * b->v0, b->nv));
    }
}

static void clothi_catch_range(int begin, int end, int worker, void *ctx) {
    const clothi_catch  *q = (const clothi_catch *)ctx;
    const cloth_collide *c = q->c;
    int                  v;
    (void)worker;
    for (v = begin; v < end; v++)
        if (c->held_of[v] < 0)
            c->look[v] = (c->sim->pin[v] & CLOTH_AXIS_ALL) != CLOTH_AXIS_ALL &&
                         c->star[v] < c->star[v + 1] &&         /* cloth hangs on it */
                         clothi_may_touch(c, v, c->obstacle[q->slot].v0) &&
                         clothi_catch_point(c, c->xa + 3 * v, v, q->slot, CLOTHI_PINCHED,
                                            c->caught + v);
}

/* Holds vertices that are between parts of a body. */
static cloth_status clothi_pinch_catch(cloth_collide *c, const double *y) {
    cloth_status status = CLOTH_OK;
    int          o, i;
    for (o = 0; o < c->nobstacle && !status; o++) {
        clothi_catch job = {c, o, c->xa, NULL, NULL};
        if (!c->obstacle[o].used || !c->obstacle[o].self_penetrating) continue;
        clothi_for(c->hooks, c->nv, CLOTHI_CATCH_GRAIN, clothi_catch_range, &job);
        for (i = 0; i < c->nv && !status; i++) {
            if (c->held_of[i] >= 0 || !c->look[i]) continue;
            c->look[i] = clothi_hold_keep(c, y + 3 * i, c->caught + i, c->hold_to + 3 * i);
            if (c->look[i] == CLOTHI_LET_GO) continue;
            c->held_of[i] = c->nholding;
            status = CLOTHI_PUSH(c, holding, c->caught[i]);
        }
    }
    return status;
}

/* Vertex v, outside, goes t farther from what is nearest than it is. */
static cloth_status clothi_pinch_out(cloth_collide *c, int v) {
    double     A[3], B[3], n[3], up;
    cloth_hold h;
    int        k;
    memset(&h, 0, sizeof h);
    h.vertex = v, h.slot = -1;
    clothi_hold_nearest(c, c->xa, c->xa + 3 * v, &h);
    clothi_hold_point(c, &h, 0, c->xa, A, n);
    clothi_hold_point(c, &h, 0, c->xb, B, n);
    up = c->obstacle[h.slot].thickness + clothi_dot3(B, n) - clothi_dot3(A, n);
    for (k = 0; k < 3; k++) c->hold_to[3 * v + k] = c->xa[3 * v + k] + up * n[k];
    c->held_of[v] = c->nholding;
    c->look[v] = CLOTHI_LED;
    return CLOTHI_PUSH(c, holding, h);
}

/* A face that crosses a body though no vertex of it is held, or an edge of it, is left from a pinch
 * that has opened: it goes out. */
static cloth_status clothi_pinch_lead(cloth_collide *c) {
    const int    n = c->nholding;
    cloth_status status = CLOTH_OK;
    int          i, k;
    for (i = 0; i < c->nnow; i++) {
        const clothi_pair_id *p = c->now + i;
        const int            *v = c->faces + 3 * p->a, *b = c->faces + 3 * p->b;
        int                   caught = 0, at = 0;
        if (p->kind != CLOTHI_FF || p->b < c->nf || !c->obstacle[c->slot[b[0]]].self_penetrating)
            continue;
        for (k = 0; k < 3; k++)
            if (c->held_of[v[k]] >= 0 && c->held_of[v[k]] < n) caught++, at = k;
        if (caught > 1 ||
            (caught && !clothi_surface_pierced(c->xa + 3 * v[(at + 1) % 3],
                                               c->xa + 3 * v[(at + 2) % 3], c->xa + 3 * b[0],
                                               c->xa + 3 * b[1], c->xa + 3 * b[2])))
            continue;
        for (k = 0; k < 3 && !status; k++)
            if (c->held_of[v[k]] < 0 && clothi_may_touch(c, v[k], b[0]) &&
                (c->sim->pin[v[k]] & CLOTH_AXIS_ALL) != CLOTH_AXIS_ALL)
                status = clothi_pinch_out(c, v[k]);
    }
    return status;
}

/* What has been caught, holds from `first` on: where it begins and which faces are in its pinch. */
static void clothi_pinch_settle(cloth_collide *c, int first) {
    for (; first < c->nholding; first++) {
        clothi_hold_aside(c, c->holding + first);
        clothi_hold_mark(c, c->holding + first);
    }
}

/* cloth_contact.substeps: what holds cloth passes in none of them by more than CLOTHI_PASSING t. */
static int clothi_pinch_substeps(void *user) {
    cloth_collide *c = (cloth_collide *)user;
    double         A[6], B[6], n[6], m[3], d[3], most = 1;
    int            i, k;
    if (c->nhold) clothi_world_pose(c, c->sim->state.x, 0, 1);
    for (i = 0; i < c->nhold; i++) {
        const cloth_hold *h = c->hold + i;
        (void)clothi_hold_room(c, h, c->xa, A, n, m);
        (void)clothi_hold_room(c, h, c->xb, B, n, m);
        for (k = 0; k < 3; k++) d[k] = B[3 + k] - A[3 + k] - (B[k] - A[k]);
        most = clothi_max(most, sqrt(clothi_dot3(d, d)) /
                                    (CLOTHI_PASSING * c->obstacle[h->slot].thickness));
    }
    return (int)ceil(clothi_min(most, CLOTH_SUBSTEPS_ASKED));
}

/* What is held in the substep, at the poses in xa and xb: of what was, what stays, and what is
 * caught. y [nv x 3]: where cloth would go by itself. */
static cloth_status clothi_pinch_begin(cloth_collide *c, const double *y) {
    const int    was = c->nholding;
    cloth_status status;
    int          i, n = 0;
    c->pinching = 0;
    if (!clothi_drags(c)) return CLOTH_OK;
    memset(c->pinched, 0, (size_t)c->mf);
    clothi_pinch_boxes(c);
    for (i = 0; i < c->nv; i++) c->held_of[i] = -1;
    for (i = 0; i < was; i++) {
        cloth_hold h = c->holding[i];
        c->look[h.vertex] = clothi_hold_keep(c, y + 3 * h.vertex, &h, c->hold_to + 3 * h.vertex);
        if (c->look[h.vertex] == CLOTHI_LET_GO) continue;
        c->held_of[h.vertex] = n;
        c->holding[n++] = h;
    }
    c->nholding = n;
    status = clothi_pinch_catch(c, y);
    if (!status) status = clothi_pinch_lead(c);
    if (!status) clothi_pinch_settle(c, 0);
    c->pinching = n < was || c->nholding > n;       /* nothing may be extrapolated over that */
    return status;
}

CLOTHI_RARE_END

static int clothi_held(const cloth_collide *c, int v) {
    return c->nholding > 0 && v < c->nv && c->held_of[v] >= 0;
}

/* Exempt since the body holds a vertex of it: all of the body's side is in a pinch, so that what
 * crosses there does not wander off it. */
static int clothi_pair_held(const cloth_collide *c, const clothi_pair_id *p) {
    const int  slot = clothi_pair_slot(c, p);
    const int *f;
    int        v[4], n = clothi_pair_vertices(c, p, v), i, held = 0;
    for (i = 0; i < n; i++)
        held |= clothi_held(c, v[i]) && c->holding[c->held_of[v[i]]].slot == slot;
    if (!held) return 0;
    f = clothi_pair_faces(c, p, v[0] < c->nv, &n);
    for (i = 0; i < n && held; i++) held = f[i] < 0 || c->pinched[f[i]];
    return held;
}

/* The part of a pull out that cloth around vertex v bears: all of it up to a stretch of its edges
 * at x^n of CLOTHI_TAUT - 1, CLOTHI_SLIP from CLOTHI_TAUT on. */
static double clothi_hold_borne(const cloth_collide *c, int v) {
    double stretch2 = 0, d2;
    int    i, k;
    for (i = c->star[v]; i < c->star[v + 1]; i++) {
        const int    *of = c->faces + 3 * c->star_face[i], at = of[0] == v ? 0 : of[1] == v ? 1 : 2;
        const double *X = c->sim->params.X + 6 * (size_t)c->star_face[i];
        for (k = 0; k < 3; k++) {
            const double x = X[2 * k] - X[2 * at], y = X[2 * k + 1] - X[2 * at + 1];
            d2 = clothi_apart2(c->xa + 3 * of[k], c->xa + 3 * v, 1);
            if (k != at) stretch2 = clothi_max(stretch2, d2 / (x * x + y * y));
        }
    }
    return clothi_max(clothi_min(CLOTHI_TAUT - sqrt(stretch2), 1), CLOTHI_SLIP);
}

/* What pulls a held vertex at x [3]: energy J, grad [3] N, hess [3x3] N/m. What is led is pushed
 * away from what is nearest alone, until it is there. */
static double clothi_hold_pull(const cloth_collide *c, const cloth_hold *h, const double *x,
                               double *grad, double *hess) {
    const cloth_model *m = c->sim->model;
    const int          face = m->topology->vf[m->topology->vf_start[h->vertex]];
    const double pull = CLOTHI_DRAG *
                        clothi_membrane_stiffness(c->sim->params.material + m->region[face]);
    const double most = c->look[h->vertex] < CLOTHI_LED
                            ? CLOTHI_HOLD : CLOTHI_PULL * clothi_hold_borne(c, h->vertex);
    const double r = most * c->obstacle[h->slot].thickness / CLOTHI_DRAG;            /* m */
    double       P[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, A[3], n[3], d[3], s;
    int          i;
    clothi_sub3(x, c->hold_to + 3 * h->vertex, d);
    if (c->look[h->vertex] == CLOTHI_LED) {
        clothi_hold_point(c, h, 0, c->xb, A, n);
        s = clothi_min(clothi_dot3(d, n), 0);
        for (i = 0; i < 9; i++) P[i] = s < 0 ? n[i / 3] * n[i % 3] : 0;
        for (i = 0; i < 3; i++) d[i] = s * n[i];
    }
    s = sqrt(1 + clothi_dot3(d, d) / (r * r));
    for (i = 0; i < 3; i++) grad[i] = pull / s * d[i];
    for (i = 0; i < 9; i++)
        hess[i] = pull / s * (P[i] - d[i / 3] * d[i % 3] / (r * r * s * s));
    return pull * clothi_dot3(d, d) / (s + 1);
}

static cloth_status clothi_hold_eval(const cloth_collide *c, const cloth_eval *e, double *energy) {
    cloth_status status = CLOTH_OK;
    double       grad[3], hess[9];
    int          i, k;
    for (i = 0; i < c->nholding && !status; i++) {
        const int v = c->holding[i].vertex;
        *energy += clothi_hold_pull(c, c->holding + i, e->x + 3 * v, grad, hess);
        for (k = 0; e->grad && k < 3; k++) e->grad[3 * v + k] += grad[k];
        if (e->hess) status = cloth_matrix_add_element(e->hess, 1, &v, hess);
    }
    return status;
}

/* What intersects at xb with a held vertex, or beside an exempt pair, joins what is exempt. */
static cloth_status clothi_pinch_list(cloth_collide *c) {
    int i, k;
    if (c->nholding == 0 && c->nnow == 0) return CLOTH_OK;
    for (i = 0; i < c->nv; i++) c->moved[i] = c->nholding > 0 && c->held_of[i] >= 0;
    for (i = 0; i < c->nnow; i++)           /* lines wander to the faces beside */
        for (k = 0; k < 3 && c->now[i].kind == CLOTHI_FF; k++) {
            c->moved[c->faces[3 * c->now[i].a + k]] = 1;
            if (c->now[i].b < c->nf) c->moved[c->faces[3 * c->now[i].b + k]] = 1;
        }
    clothi_move_features(c);
    return clothi_broad_phase(c, c->xb, NULL, CLOTHI_ENDED, 0, CLOTHI_MOVED | CLOTHI_TOUCH);
}

/* ===== [8.4] IMPACT ZONES ====================================================================
 *
 *     x^n o------------o x_IE      The guess of a step may pass through things. Every hit of
 *          \      /////            detection on the way there is a row, n . sum w x >= bound; rows
 *           \__o_/////             that share a vertex are a zone. The feasible point nearest to
 *                                  the guess,
 *
 *              min sum m_i |x_i - x_IE,i|^2 / 2     s.t. its rows                         [6.1]
 *
 * is looked at again, and what it hits joins, until nothing does [BFA02] [HVTG08]. A row that does
 * not push there is dropped: the point stays the nearest without it, so each program that is solved
 * lies farther from the guess than the last, and none comes twice. With the latest row of a pair
 * alone zones go round in circles; with all of them cloth in a pinch has zones that no point meets.
 * A zone that the program cannot solve, or not within desc.max_passes, or whose solution is three
 * times as far off as anything goes, goes on as one body that does not turn: sheets that do, and
 * spin, fail nearly every step.
 * Where that leads nowhere an implicit step tries once more, with all that is near obstacles
 * carried by them and rows that ask for no more room than detection leaves: layers between an arm
 * and a chest that come nearer have no point at their gaps of x^n. The third time what is in a
 * pinch inside of a face or an edge is held as well, by its nearest vertex [8.3]. Then the step
 * fails.
 *
 * Under implicit steps this is where minimising begins, not where it ends: no strain of the
 * projection stays, and no row is in the accepted state. Where obstacles move, x_IE near them is
 * where they carry it. Among obstacles that rest the straight way up to the first hit is feasible
 * too, and the better of the two is taken, or a sheet thrown at a box can gain thirty times its
 * energy. Where the rows become more than two a vertex it is taken at once. A guess no farther than
 * a list's slack is looked at in that list [8.2], which stays for the minimiser. Figures:
 * tests/bench/bench_contact.c.
 * LEAPFROG ends each substep with it; velocities are then min |v - v*|^2_M/2 with no approach on
 * the active rows: neither gives kinetic energy where obstacles rest [9.4].
 *
 * [BFA02] Bridson, Fedkiw, Anderson, SIGGRAPH 2002.  [HVTG08] Harmon et al., SIGGRAPH 2008.
 * checked: tests/test_contact.c, test_convex.c, stability/throws.c, stability/heaps.c
 */

#define CLOTHI_RIGID_PASSES 20              /* more, after the last QP                         */
#define CLOTHI_LARGE_ZONE   200             /* rows; larger ones are solved one by one         */
#define CLOTHI_LARGE_SETS   600             /* active sets tried of them; 260 were needed      */
#define CLOTHI_CARRIED       20             /* t: so far obstacles carry cloth in a guess      */
#define CLOTHI_START_ROWS   2               /* a vertex: more for a start of minimising are dear */
#define CLOTHI_ASTRAY       3               /* longest ways of anything; up to 1.4 were needed */
#define CLOTHI_ZONE_GRAIN   4               /* zones of a range; most have a few rows          */

/* --- rows --- */

/* A row as a contact, without friction. */
static clothi_contact clothi_row_contact(const cloth_collide *c, const cloth_contact_row *row) {
    const clothi_pair_id p = {row->kind, row->a, row->b};
    clothi_contact       q;
    clothi_contact_of(c, &p, &q);
    memcpy(q.w, row->w, sizeof q.w);
    memcpy(q.normal, row->normal, sizeof q.normal);
    return q;
}

/* --- detection --- */

/* Looks at one pair over the substep; *hit counts, a row is made: where it is hit, or at the end
 * where that row would hold there and keep nothing off, as where the tolerance of the time of
 * impact is not small beside the gap. */
static cloth_status clothi_detect_pair(cloth_collide *c, const clothi_pair_id *p, int *hit) {
    cloth_contact_row row;
    double            xa[12], xb[12], toi, held, start, sep, radius, t, gap, end;
    const int         slot = clothi_pair_slot(c, p);
    int               i, k;
    if (clothi_is_exempt(c, p)) return CLOTH_OK;
    memset(&row, 0, sizeof row);
    row.kind = p->kind, row.a = p->a, row.b = p->b;
    row.n = clothi_pair_vertices(c, p, row.v);
    clothi_pair_points(c, c->xa, row.v, row.n, xa);
    clothi_pair_points(c, c->xb, row.v, row.n, xb);
    radius = clothi_slot_radius(c, slot);
    start = clothi_pair_gap(c, c->xa, p);
    if (clothi_gap_touches(start, 0, xa, row.n))    /* obstacles may have closed to t/50 000 */
        return c->trying ? CLOTH_ERR_STEP
                         : clothi_fail_pairs(c, p, 1, "have no gap",    /* and no side to keep */
                                             ". Cloth begins with gaps of a thickness or more");
    t = clothi_pair_thickness(c, p, row.v);
    sep = clothi_min(CLOTHI_SEPARATION * t, 0.5 * (start + clothi_pair_pole(c, t, start)));
    if (p->kind == CLOTHI_VP) {             /* a plane: the distance is linear in time */
        held = clothi_pair_gap(c, c->xb, p);
        if (held >= sep) return CLOTH_OK;
        toi = (start - sep) / (start - held);
        row.w[0] = 1, row.w[1] = -1;
        memcpy(row.normal, c->obstacle[slot].normal, sizeof row.normal);
        held = start;
    } else if (!clothi_ccd_pair(p->kind == CLOTHI_EE, xa, xb, radius + sep, &toi))
        return CLOTH_OK;
    else {
        /* what is off in toi is off in its derivative [8.8]: Newton's steps to the gap of sep */
        for (k = c->sim->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG ? 3 : 0;; k--) {
            held = clothi_contact_frame(p->kind == CLOTHI_EE, xa, xb, toi, row.w, row.normal);
            for (gap = end = 0, i = 0; i < 12 && k > 0; i++) {
                gap += row.w[i / 3] * row.normal[i % 3] * ((1 - toi) * xa[i] + toi * xb[i]);
                end += row.w[i / 3] * row.normal[i % 3] * (xb[i] - xa[i]);
            }
            if (!(fabs(radius + sep - gap) < -1e-3 * end)) break;
            toi += (radius + sep - gap) / end;
        }
        for (end = 0, i = 0; i < 12; i++) end += row.w[i / 3] * row.normal[i % 3] * xb[i];
        if (end >= radius + sep && clothi_pair_gap(c, c->xb, p) < sep)
            held = clothi_contact_frame(p->kind == CLOTHI_EE, xb, xb, 0, row.w, row.normal);
    }
    gap = c->approach < CLOTHI_APPROACH ? 1.1 * sep : clothi_max(held - radius, 1.1 * sep);
    gap = clothi_min(CLOTHI_GAP * t, gap);
    row.toi = toi, row.bound = radius + gap, row.slack = gap - sep;
    for (i = 0; i < row.n; i++)             /* what is of obstacles */
        for (k = 0; row.v[i] >= c->nv && k < 3; k++) {
            const double a = c->xa[3 * row.v[i] + k], b = c->xb[3 * row.v[i] + k];
            row.bound -= row.w[i] * row.normal[k] * b;
            row.speed -= row.w[i] * row.normal[k] * (b - a) / c->h;
        }
    row.zone = -1, row.pass = c->report.passes;
    ++*hit;
    return CLOTHI_PUSH(c, row, row);
}

enum { CLOTHI_HIT_MOVED = 1, CLOTHI_HIT_NEAR = 2 };

/* Which pairs moved, and which of them come within d_min: nearly all of detection's work. */
static void clothi_hit_range(int begin, int end, int worker, void *ctx) {
    cloth_collide *c = (cloth_collide *)ctx;
    int            i;
    (void)worker;
    for (i = begin; i < end; i++) {
        const clothi_pair_id *p = &c->pair[i].id;
        const int slot = clothi_pair_slot(c, p);
        double xa[12], xb[12], toi, reach = clothi_slot_radius(c, slot);
        int    v[4];
        if (!clothi_pair_moved(c, p->kind, p->a, p->b) || clothi_is_soft(c, p) ||
            (c->listed && c->pair[i].slack > clothi_pair_far(c, c->travel, p)))
            continue;
        c->pair[i].hit = p->kind == CLOTHI_VP ? CLOTHI_HIT_NEAR : CLOTHI_HIT_MOVED;
        if (p->kind == CLOTHI_VP) continue;
        (void)clothi_pair_vertices(c, p, v);
        clothi_pair_points(c, c->xa, v, 4, xa);
        clothi_pair_points(c, c->xb, v, 4, xb);
        reach += CLOTHI_SEPARATION * clothi_slot_thickness(c, slot);
        if (clothi_ccd_pair(p->kind == CLOTHI_EE, xa, xb, reach, &toi))
            c->pair[i].hit |= CLOTHI_HIT_NEAR;
    }
}

/* All hits of what moved since the last pass, in the order of the pairs. list: the pairs are those
 * of a list, which stays for the minimiser where nothing is hit; obstacles rest. */
static cloth_status clothi_detect(cloth_collide *c, int list, int *hit) {
    cloth_status status;
    int          i;
    *hit = c->listed = 0;
    clothi_move_features(c);
    status = list ? clothi_list_make(c, c->xa, c->xb)
                  : clothi_broad_phase(c, c->xa, c->xb, CLOTHI_SWEPT,
                                       CLOTHI_SEPARATION * c->thickest,
                                       c->report.passes > 0 ? CLOTHI_MOVED : 0);
    for (i = 0; i < 3 * c->nv && list; i++) c->qp_x[i] = c->xb[i] - c->xa[i];
    if (list) clothi_move_far(c, c->qp_x);
    if (!status) clothi_for(c->hooks, c->npair, CLOTHI_HIT_GRAIN, clothi_hit_range, c);
    for (i = 0; i < c->npair && !status; i++) {
        const int seen = c->pair[i].hit;
        c->pair[i].hit = 0;
        c->report.candidates += seen & CLOTHI_HIT_MOVED;
        if (seen & CLOTHI_HIT_NEAR) status = clothi_detect_pair(c, &c->pair[i].id, hit);
    }
    c->listed &= *hit == 0;
    c->report.impacts += *hit;
    return status;
}

/* --- zones --- */

static int clothi_movable(const cloth_collide *c, int v) {
    return v < c->nv && !c->frozen[v] && (c->sim->pin[v] & CLOTH_AXIS_ALL) != CLOTH_AXIS_ALL;
}

/* The vertex that moves a row's i-th one along axis i % 3, itself or what it is tied to; -1: none
 * can. */
static int clothi_row_mover(const cloth_collide *c, const cloth_contact_row *row, int i) {
    const int v = row->v[i / 3], u = v < c->nv ? clothi_leader(c->sim->model, v, i % 3) : v;
    return clothi_movable(c, u) ? u : -1;
}

/* Numbers the zones in the order of their first row and counts their rows and vertices; returns how
 * many zones there are. Rows without a movable vertex get zone -1. */
static int clothi_zone_number(cloth_collide *c) {
    int *parent = c->zone_of, *number = c->zone_number, nzone = 0, i, k;
    for (i = 0; i < c->nv; i++) parent[i] = i, number[i] = c->local[i] = -1;
    for (i = 0; i < c->nrow; i++) {
        int first = -1;
        for (k = 0; k < 3 * c->row[i].n; k++) {
            const int v = clothi_row_mover(c, c->row + i, k);
            if (v < 0) continue;
            if (first >= 0) (void)clothi_join(parent, first, v);
            first = v;
        }
        c->row[i].zone = first;
    }
    for (i = 0; i < c->nrow; i++) {
        cloth_contact_row *row = c->row + i;
        int               *at = row->zone < 0 ? NULL : number + clothi_find_root(parent, row->zone);
        if (!at) continue;
        if (*at < 0) memset(c->zone + nzone, 0, sizeof *c->zone), *at = nzone++;
        row->zone = *at;
        c->zone[*at].rows++;
        c->zone[*at].fresh |= row->pass == c->report.passes;
    }
    for (i = 0; i < c->nv; i++) {
        k = number[clothi_find_root(parent, i)];
        if (k >= 0) c->zone[k].size++;
    }
    return nzone;
}

/* The zones of the rows, and their slices of the scratch, by rows or by vertices. Workers do not
 * ask the allocator: what their QPs take, they have. */
static cloth_status clothi_zone_make(cloth_collide *c, int *nzone, const double *v) {
    const size_t n = (size_t)c->nrow;
    cloth_status status = CLOTHI_ROOM(c, zone, c->nrow);
    int          z, i, k, r = 0, at = 0, most = 0;
    if (!status) status = CLOTHI_ROOM(c, zone_order, 15 * c->nrow);
    if (!status) status = CLOTHI_ROOM(c, qp_val, 15 * c->nrow);
    if (status) return status;
    c->zone_v = v;
    *nzone = clothi_zone_number(c);
    for (z = 0; z < *nzone; z++) {
        clothi_zone *q = c->zone + z;
        q->order = c->zone_order + r, q->row = c->zone_order + n + r + z;
        q->col = c->zone_order + 3 * n + 12 * r;
        q->val = c->qp_val + 12 * r, q->h = c->qp_val + 12 * n + r, q->lambda = q->h + n;
        q->guess = q->lambda + n;
        q->member = c->member + at, q->minv = c->qp_minv + 3 * at;
        q->x0 = c->qp_x0 + 3 * at, q->x = c->qp_x + 3 * at;
        if (q->rows <= CLOTHI_LARGE_ZONE && q->rows > most) most = q->rows;
        r += q->rows, at += q->size, q->rows = q->size = 0;
    }
    for (i = 0; i < c->nrow; i++) {
        const cloth_contact_row *row = c->row + i;
        clothi_zone             *q = c->zone + (row->zone < 0 ? 0 : row->zone);
        if (row->zone < 0) continue;
        q->order[q->rows++] = i;
        for (k = 0; k < 3 * row->n; k++) {
            const int by = clothi_row_mover(c, row, k);
            if (by >= 0 && c->local[by] < 0) q->member[c->local[by] = q->size++] = by;
        }
    }
    for (i = 0; c->tied && i < 3 * c->nv; i++) c->tied[i] = 0;
    for (i = 0; c->tied && i < 3 * c->nv; i++)
        c->tied[3 * clothi_leader(c->sim->model, i / 3, i % 3) + i % 3] +=
            c->sim->params.mass[i / 3];
    for (z = 0; z < c->nwork && c->hooks->parallel.run && most > 0; z++)
        if (!clothi_qp_reserve(c->work[z], most, 12 * most, 12 * CLOTHI_LARGE_ZONE))
            return CLOTH_ERR_MEMORY;
    return CLOTH_OK;
}

/* The zone's QP: unknowns are its vertices, 3 each; what is pinned on an axis has minv 0 there,
 * masses are relative to their mean. On velocities: of the rows with a multiplier. */
static void clothi_zone_qp(const cloth_collide *c, clothi_zone *q) {
    const double *mass = c->sim->params.mass, *from = c->zone_v ? c->zone_v : c->x_ie;
    const double *x = c->sim->model->x;
    int    m = 0, nnz = 0, r, i, j, k;
    for (r = 0; r < q->rows; r++) {
        const cloth_contact_row *row = c->row + q->order[r];
        if (c->zone_v && !(row->multiplier > 0)) continue;
        q->row[m] = nnz;
        q->h[m] = c->zone_v ? -row->speed : -row->bound;
        for (i = 0; i < 3 * row->n; i++) {
            const int    at = 3 * row->v[i / 3] + i % 3, v = clothi_row_mover(c, row, i);
            const double g = row->w[i / 3] * row->normal[i % 3];
            if (row->v[i / 3] >= c->nv) continue;
            if (v < 0) {
                q->h[m] += g * (c->zone_v ? (c->xb[at] - c->xa[at]) / c->h : c->xb[at]);
                continue;
            }
            k = 3 * c->local[v] + i % 3;
            for (j = q->row[m]; j < nnz && q->col[j] != k; j++) {}
            if (j == nnz) q->col[nnz] = k, q->val[nnz++] = -g;
            else q->val[j] -= g;
            if (!c->zone_v) q->h[m] += g * (x[at] - x[3 * v + i % 3]);
        }
        m++;
    }
    q->row[m] = nnz;
    for (i = 0; i < q->size; i++) q->mean += mass[q->member[i]] / q->size;
    for (i = 0; i < 3 * q->size; i++) {
        const int    v = q->member[i / 3];
        const double of = c->tied ? c->tied[3 * v + i % 3] : mass[v];
        q->minv[i] = c->sim->pin[v] >> i % 3 & 1 || !(of > 0) ? 0 : q->mean / of;
        q->x0[i] = from[3 * v + i % 3];
    }
    q->m = m;
}

/* The most that numbers of a [n] and b [n] are apart. */
static double clothi_farthest(int n, const double *a, const double *b) {
    double most = 0;
    int    i;
    for (i = 0; i < n; i++) most = clothi_max(most, fabs(a[i] - b[i]));
    return most;
}

/* Rows that no point nearby meets lead far off, and what is hit from there makes rows without end:
 * a shirt's step had two million. */
static int clothi_zone_astray(const cloth_collide *c, const clothi_zone *q) {
    return !(clothi_farthest(3 * q->size, q->x, q->x0) <= CLOTHI_ASTRAY * c->stride);
}

/* Solves the zone's QP, in the worker's memory, from what the last pass found; the new rows may
 * hold. Refused, as numbers are too large: it is not solved. */
static void clothi_zone_solve(const cloth_collide *c, clothi_zone *q, int worker,
                              const cloth_cancel *cancel) {
    const cloth_qp   qp = {3 * q->size, q->m, q->minv, q->x0, q->row, q->col, q->val, q->h};
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  rep;
    int              r;
    for (r = 0; r < q->m && !c->zone_v; r++) {
        const cloth_contact_row *row = c->row + q->order[r];
        q->guess[r] = row->pass == c->report.passes ? 1 : row->multiplier;
    }
    o.hooks.allocator = c->hooks->allocator;
    o.work = c->work[worker], o.guess = c->zone_v ? NULL : q->guess;
    if (q->rows > CLOTHI_LARGE_ZONE) o.max_iterations = CLOTHI_LARGE_SETS;
    if (cancel) o.hooks.cancel = *cancel;
    q->status = cloth_qp_solve(&qp, &o, q->x, q->lambda, &rep);
    q->iterations = rep.iterations;
    if (q->status != CLOTH_ERR_MEMORY && q->status != CLOTH_ERR_CANCELLED) q->status = CLOTH_OK;
    q->solved = !q->status && rep.outcome == CLOTH_QP_SOLVED &&
                (c->zone_v || !clothi_zone_astray(c, q));
}

/* Slices, vertices and work are their own and no hook is called: same bits for any workers. */
static void clothi_zone_range(int begin, int end, int worker, void *ctx) {
    const cloth_collide *c = (const cloth_collide *)ctx;
    int                  z;
    for (z = begin; z < end; z++) {
        clothi_zone *q = c->zone + z;
        if (!c->zone_v && !q->fresh) continue;
        clothi_zone_qp(c, q);
        if (q->m > 0 && q->rows <= CLOTHI_LARGE_ZONE) clothi_zone_solve(c, q, worker, NULL);
    }
}

/* The QPs of all zones, large ones after the others: they ask the hooks. */
static void clothi_zones_solve(cloth_collide *c, int nzone) {
    int z;
    clothi_for(c->hooks, nzone, CLOTHI_ZONE_GRAIN, clothi_zone_range, c);
    for (z = 0; z < nzone; z++)
        if (c->zone[z].m > 0 && c->zone[z].rows > CLOTHI_LARGE_ZONE)
            clothi_zone_solve(c, c->zone + z, 0, &c->hooks->cancel);
}

/* A row of this pass that holds where its pair stays, though that goes through on the way. */
static int clothi_row_passed(const cloth_collide *c, const cloth_contact_row *row) {
    const clothi_pair_id id = {row->kind, row->a, row->b};
    double               xa[12], xb[12], toi;
    int                  i;
    for (i = 0; i < row->n; i++)
        if (row->v[i] < c->nv && c->moved[row->v[i]]) return 0;
    if (row->kind == CLOTHI_VP || row->pass != c->report.passes) return 0;
    clothi_pair_points(c, c->xa, row->v, 4, xa);
    clothi_pair_points(c, c->xb, row->v, 4, xb);
    return clothi_ccd_pair(row->kind == CLOTHI_EE, xa, xb,
                           clothi_slot_radius(c, clothi_pair_slot(c, &id)), &toi);
}

/* The solution into xb; 0: it keeps something from nothing. */
static int clothi_zone_accept(cloth_collide *c, const clothi_zone *q) {
    double push = 0, mass = 0;
    int    i, k, r;
    for (r = 0; r < q->m; r++) c->row[q->order[r]].multiplier = q->lambda[r] * q->mean;
    for (i = 0; i < q->size; i++) {
        const int v = q->member[i];
        for (k = 0; k < 3; k++) {
            const double d = q->x[3 * i + k] - c->x_ie[3 * v + k];
            double      *x = c->xb + 3 * v + k;
            push += c->sim->params.mass[v] * d * d;
            if (q->x[3 * i + k] < *x || q->x[3 * i + k] > *x) c->moved[v] = 1;
            *x = q->x[3 * i + k];
        }
        mass += c->sim->params.mass[v];
    }
    c->report.push = clothi_max(c->report.push, sqrt(push / mass));
    for (r = 0; r < q->rows && !clothi_row_passed(c, c->row + q->order[r]); r++) continue;
    return r == q->rows;
}

/* A zone becomes rigid: it goes as a whole, as the obstacles that it touches and what is pinned do
 * in the mean; where there is none, by its own momentum. */
static void clothi_zone_freeze(cloth_collide *c, const clothi_zone *q) {
    const double *mass = c->sim->params.mass;
    double        motion[3] = {0, 0, 0}, weight = 0;
    int           r, i, k, v, held = 0;
    for (r = 0; r < q->rows; r++) {
        cloth_contact_row *row = c->row + q->order[r];
        row->multiplier = 0;
        for (i = 0; i < row->n; i++) {
            v = row->v[i];
            if (v < c->nv && !c->sim->pin[v] && !c->frozen[v]) continue;
            held = 1;
            weight += fabs(row->w[i]);
            for (k = 0; k < 3; k++)
                motion[k] += fabs(row->w[i]) * (c->xb[3 * v + k] - c->xa[3 * v + k]);
        }
    }
    for (i = 0; i < q->size && !held; i++) {
        v = q->member[i];
        weight += mass[v];
        for (k = 0; k < 3; k++) motion[k] += mass[v] * (c->x_ie[3 * v + k] - c->xa[3 * v + k]);
    }
    for (k = 0; k < 3 && weight > 0; k++) motion[k] /= weight;
    for (i = 0; i < q->size; i++) {
        v = q->member[i];
        for (k = 0; k < 3; k++)
            if (!(c->sim->pin[v] >> k & 1)) c->xb[3 * v + k] = c->xa[3 * v + k] + motion[k];
        c->moved[v] = 1;
        c->frozen[v] = 1;
    }
    c->report.rigid_zones++;
}

/* Lists the hits of the last pass as what could not be resolved. */
static cloth_status clothi_failed_pairs(cloth_collide *c) {
    cloth_status status = CLOTH_OK;
    int          i;
    if (c->trying) return CLOTH_ERR_STEP;
    for (c->nnow = 0, i = 0; i < c->nrow && !status; i++) {
        const clothi_pair_id p = {c->row[i].kind, c->row[i].a, c->row[i].b};
        if (c->row[i].pass == c->report.passes) status = CLOTHI_PUSH(c, now, p);
    }
    return status ? status : clothi_fail_pairs(c, c->now, c->nnow, "could not be resolved", "");
}

/* Of zones that were solved, rows that do not push. */
static void clothi_rows_drop(cloth_collide *c) {
    int i, n = 0;
    for (i = 0; i < c->nrow; i++) {
        const cloth_contact_row *row = c->row + i;
        const clothi_zone       *q = row->zone < 0 ? NULL : c->zone + row->zone;
        if (!q || !q->fresh || !q->solved || row->multiplier > 0) c->row[n++] = *row;
    }
    c->nrow = n;
}

/* One pass over the rows, of which those of this pass are new. */
static cloth_status clothi_zones(cloth_collide *c) {
    const int    rigid = c->report.passes >= c->desc.max_passes;
    int          nzone, z, r;
    cloth_status status = clothi_zone_make(c, &nzone, NULL);
    if (status) return status;
    if (nzone > c->report.zones) c->report.zones = nzone;
    if (c->nrow > c->report.rows) c->report.rows = c->nrow;
    memset(c->moved, 0, (size_t)c->nv);
    for (r = 0; r < c->nrow; r++)
        if (c->row[r].pass == c->report.passes && c->row[r].zone < 0)
            return clothi_failed_pairs(c);      /* a hit among rigid zones alone */
    if (!rigid) clothi_zones_solve(c, nzone);
    for (z = 0; z < nzone && !status; z++) {
        clothi_zone *q = c->zone + z;
        if (!q->fresh) continue;
        c->report.qp_iterations += q->iterations;
        if (q->rows > c->report.largest_zone && !rigid) c->report.largest_zone = q->rows;
        status = q->status;
        if (!status && !(q->solved && clothi_zone_accept(c, q))) clothi_zone_freeze(c, q);
    }
    clothi_tie_place(c->sim->model, c->xb);
    if (c->tied) memset(c->moved, 1, (size_t)c->nv);
    if (!status) clothi_rows_drop(c);
    return status;
}

/* Neither obstacles nor pins move: on the way from x^n to x_IE every point is a state. */
static int clothi_ends_rest(const cloth_collide *c) {
    const size_t skip = 3 * (size_t)c->nv;
    int          i;
    for (i = 0; i < 3 * c->nv; i++)
        if (c->sim->pin[i / 3] >> (i % 3) & 1 && (c->x_ie[i] < c->xa[i] || c->x_ie[i] > c->xa[i]))
            return 0;
    return memcmp(c->xa + skip, c->xb + skip,
                  3 * (size_t)(c->nw - c->nv) * sizeof(double)) == 0;
}

/* Where all ends rest, the way to where the first pair meets is free. */
static void clothi_part_way(const cloth_collide *c, double *x) {
    int i;
    for (i = 0; i < 3 * c->nv; i++)
        x[i] = c->xa[i] + CLOTHI_MOVE * c->toi * (c->x_ie[i] - c->xa[i]);
}

/* The way to x_IE, none of which has been looked at. */
static void clothi_try_guess(cloth_collide *c) {
    clothi_tie_place(c->sim->model, c->x_ie);
    memcpy(c->xb, c->x_ie, 3 * (size_t)c->nv * sizeof(double));
    memset(c->moved, 1, (size_t)c->nv);
    memset(c->frozen, 0, (size_t)c->nv);
    c->nrow = c->report.passes = 0;
}

/* From x_IE, zones until detection finds nothing. */
static cloth_status clothi_feasible_from(cloth_collide *c, int last) {
    const int    rests = clothi_ends_rest(c) && !last;
    cloth_status status = CLOTH_OK;
    double       way;
    int          list, i, hit = 0;
    c->toi = 1;
    clothi_try_guess(c);
    way = clothi_farthest(3 * c->nw, c->xb, c->xa);
    c->stride = clothi_max(way, c->thickest);
    list = rests && way <= CLOTHI_LIST_SLACK * c->thickest;
    for (; !status; c->report.passes++) {
        const double start = clothi_now(c->hooks);
        double       then;
        if (c->until && c->report.passes == c->until) break;
        status = clothi_detect(c, list && c->report.passes == 0, &hit);
        then = clothi_now(c->hooks);
        c->report.ms_detect += 1e3 * (then - start);
        for (i = 0; i < c->nrow && c->report.passes == 0; i++)
            c->toi = clothi_min(c->toi, c->row[i].toi);
        if (status) return status;
        if (rests && c->nrow > CLOTHI_START_ROWS * c->nv) {
            clothi_part_way(c, c->xb);
            c->nrow = 0;
            return CLOTH_OK;
        }
        if (hit == 0) return CLOTH_OK;
        status = clothi_cancelled(c->hooks, NULL);
        if (status) return status;
        if (c->report.passes > c->desc.max_passes + CLOTHI_RIGID_PASSES)
            return clothi_failed_pairs(c);
        status = clothi_zones(c);
        c->report.ms_zones += 1e3 * (clothi_now(c->hooks) - then);
    }
    return status;
}

typedef struct clothi_carrying {
    cloth_collide *c;
    int            all;                     /* by what rests too                               */
} clothi_carrying;

static void clothi_carried_range(int begin, int end, int worker, void *ctx) {
    const clothi_carrying *job = (const clothi_carrying *)ctx;
    cloth_collide         *c = job->c;
    const clothi_surface   solid = {c->xa, c->faces, NULL, NULL, &c->solid};
    const double           reach = CLOTHI_CARRIED * c->thickest;
    int                    i, j, k, f;
    (void)worker;
    for (i = begin; i < end; i++) {
        const cloth_hold *h = clothi_held(c, i) ? c->holding + c->held_of[i] : NULL;
        double            A[3], B[3], w[3], way[3] = {0, 0, 0}, d2 = reach * reach, part = 1;
        for (j = 0; j < 2 && h; j++) {
            clothi_hold_point(c, h, j, c->xa, A, w);
            clothi_hold_point(c, h, j, c->xb, B, w);
            for (k = 0; k < 3; k++) way[k] += 0.5 * (B[k] - A[k]);
        }
        f = h ? -1 : clothi_surface_nearest(&solid, c->xa + 3 * i, &d2, w);
        if (f >= 0 && !clothi_may_touch(c, i, c->faces[3 * f])) f = -1;
        if (!h) part = f < 0 ? 0 : 1 - sqrt(d2) / reach;
        for (j = 0; j < 9 && f >= 0; j++) {
            const int v = 3 * c->faces[3 * f + j / 3] + j % 3;
            way[j % 3] += w[j / 3] * (c->xb[v] - c->xa[v]);
        }
        if (!job->all && !(clothi_max_abs(way, 3) > 0)) continue;
        for (k = 0; k < 3; k++)
            if (!(c->sim->pin[i] >> k & 1))
                c->x_ie[3 * i + k] += part * (c->xa[3 * i + k] + way[k] - c->x_ie[3 * i + k]);
    }
}

/* x_IE where obstacles carry cloth: with the nearest point of a surface, held cloth with both of
 * its points, the less the farther up to CLOTHI_CARRIED t, pins to where they go. Layers and gaps
 * stay as they are. By what rests only where `all`: the guess may slide along it. */
static void clothi_carried(cloth_collide *c, int all) {
    clothi_carrying job = {c, all};
    clothi_pinch_boxes(c);
    clothi_for(c->hooks, c->nv, CLOTHI_CATCH_GRAIN, clothi_carried_range, &job);
}

/* Whether cloth is in a pinch where a row has it, inside of a face or an edge that has no held
 * vertex; a hold of the vertex nearest to there. */
static int clothi_row_hold(const cloth_collide *c, const cloth_contact_row *row, cloth_hold *h) {
    const clothi_pair_id id = {row->kind, row->a, row->b};
    const int            slot = clothi_pair_slot(c, &id);
    double               p[3] = {0, 0, 0}, most = 0, sum = 0;
    int                  at = -1, k, j;
    if (slot < 0 || !c->obstacle[slot].self_penetrating) return 0;
    for (k = 0; k < row->n; k++) {
        const int v = row->v[k];
        if (v >= c->nv) continue;
        if (clothi_held(c, v)) return 0;
        sum += row->w[k];
        for (j = 0; j < 3; j++) p[j] += row->w[k] * c->xa[3 * v + j];
        if (fabs(row->w[k]) > most && clothi_movable(c, v)) most = fabs(row->w[k]), at = v;
    }
    for (j = 0; j < 3; j++) p[j] /= sum;
    return at >= 0 && clothi_catch_point(c, p, at, slot, CLOTHI_PINCHED, h);
}

/* Where zones lead nowhere: of what is hit on the way to x_IE, holds what is in a pinch between
 * vertices. A finger's end is narrower than a face, and cloth between it and a hip went nowhere. */
static cloth_status clothi_pinch_rows(cloth_collide *c) {
    const int    n = c->nholding;
    cloth_status status;
    int          i, hit;
    clothi_try_guess(c);
    status = clothi_detect(c, 0, &hit);
    clothi_pinch_boxes(c);
    for (i = 0; i < c->nrow && !status; i++) {
        cloth_hold h;
        if (!clothi_row_hold(c, c->row + i, &h)) continue;
        c->look[h.vertex] = CLOTHI_HELD;
        c->held_of[h.vertex] = c->nholding;
        clothi_hold_goal(c, &h, c->hold_to + 3 * h.vertex);
        status = CLOTHI_PUSH(c, holding, h);
    }
    if (!status) clothi_pinch_settle(c, n);
    c->pinching |= c->nholding > n;
    return status;
}

/* A feasible point into xb: from x_IE, what is held where it goes; for minimising to go on from,
 * once more from where cloth is carried, and once with what is in a pinch between vertices held.
 * last: it is to be where the step ends. */
static cloth_status clothi_feasible(cloth_collide *c, int last) {
    const int    most = last ? 1 : clothi_drags(c) ? 3 : 2;
    cloth_status status = CLOTH_ERR_STEP;
    int          attempt, i;
    for (i = 0; i < 3 * c->nholding; i++) {
        const int v = c->holding[i / 3].vertex, at = 3 * v + i % 3;
        if (!(c->sim->pin[v] >> i % 3 & 1)) c->x_ie[at] = c->hold_by[at];
    }
    for (attempt = 0; attempt < most && status == CLOTH_ERR_STEP; attempt++) {
        c->trying = attempt + 1 < most;
        status = attempt == 2 ? clothi_pinch_rows(c) : CLOTH_OK;
        if (status) break;
        if (attempt > 0) {
            clothi_carried(c, 1);
            c->approach = CLOTHI_SQUEEZED;
        }
        status = clothi_feasible_from(c, last);
    }
    c->trying = 0;
    return status;
}

/* Velocities of an explicit substep: min 1/2 |v - v*|^2_M with no approach on the active rows. Not
 * the mean ones, of which a correction of the gap would be part. */
static cloth_status clothi_zone_speeds(cloth_collide *c, double *v) {
    int          nzone, z, i, k;
    cloth_status status = clothi_zone_make(c, &nzone, v);
    if (status) return status;
    clothi_zones_solve(c, nzone);
    for (z = 0; z < nzone && !status; z++) {
        const clothi_zone *q = c->zone + z;
        status = q->status;
        c->report.qp_iterations += q->iterations;
        for (i = 0; i < 3 * q->size && q->solved; i++) v[3 * q->member[i / 3] + i % 3] = q->x[i];
        for (i = k = 0; i < q->rows && q->solved; i++)
            if (c->row[q->order[i]].multiplier > 0)
                c->row[q->order[i]].impulse = q->lambda[k++] * q->mean;
    }
    for (i = 0; i < c->nv; i++)             /* what became rigid moves as it moved */
        for (k = 0; c->frozen[i] && k < 3; k++)
            v[3 * i + k] = (c->xb[3 * i + k] - c->xa[3 * i + k]) / c->h;
    return status;
}

/* ===== [8.5] THE CONTACT IN THE STEP =========================================================
 *
 *   begin    poses of the substep; what is held in pinches                                  [8.3]
 *   start    the guess to a feasible point                                                  [8.4]
 *   Newton   update: pairs near x, frames, shares, limits of friction                       [8.2]
 *            eval: energy, gradient, Hessian
 *            max_step: the part of dx that leaves every pair above its pole
 *   close    forces of the contacts, anchors of the next step, what intersects in pinches
 *   commit   state: poses, anchors, holds, exempt pairs
 *
 * The substep works on copies (next, now, holding) of what is state (anchor, exempt, hold): a step
 * that fails leaves all as it was.
 * checked: tests/test_collide_state.c, test_ledger.c, test_pinch.c
 */

/* Axes of a contact's surface at world positions x: its normal and, in the plane across it, the
 * first edge of what is on the obstacle's side (cloth on cloth: on the second side). 0: no such
 * edge. */
static int clothi_contact_axes(const cloth_collide *c, const clothi_contact *q, const double *x,
                               const double *n, double *axes) {
    const int *v = q->v + (q->kind == CLOTHI_VF ? 1 : q->slot >= 0 && q->v[0] >= c->nv ? 0 : 2);
    double     along, size;
    int        k;
    if (q->kind == CLOTHI_VP || (q->slot >= 0 && v[0] < c->nv)) return 0;
    clothi_sub3(x + 3 * v[1], x + 3 * v[0], axes);
    along = clothi_dot3(axes, n);
    for (k = 0; k < 3; k++) axes[k] -= along * n[k];
    size = sqrt(clothi_dot3(axes, axes));
    if (!(size > 0)) return 0;
    for (k = 0; k < 3; k++) axes[k] /= size;
    clothi_cross3(n, axes, axes + 3);
    return 1;
}

/* a turns as a drum's surface does in the substep; side -1: back. */
static void clothi_surface_turn(const cloth_collide *c, const clothi_obstacle *o, double side,
                                double *a) {
    double u[3], way[3];
    int    k;
    if (!o || !(clothi_max_abs(o->surface + 3, 3) > 0)) return;
    clothi_cross3(o->surface + 3, a, u);
    clothi_surface_way(c, o, o->swing[side > 0], u, way);
    for (k = 0; k < 3; k++) a[k] += side * way[k];
}

/* The elastic slip turns with the surface in the substep. */
static void clothi_contact_turn(const cloth_collide *c, const clothi_contact *q, double *slip) {
    const clothi_obstacle *o = q->slot < 0 ? NULL : c->obstacle + q->slot;
    clothi_frame           f;
    double                 a[6], b[6], s[3];
    int                    k;
    clothi_surface_turn(c, o, 1, slip);
    if (o && !clothi_is_mesh(o)) {
        clothi_turned(o->turned[0], o->turned[1], slip, slip);
        return;
    }
    clothi_contact_frame_at(c, q, c->xa, &f);
    if (!clothi_contact_axes(c, q, c->xa, f.normal, a) ||
        !clothi_contact_axes(c, q, c->xb, q->normal, b))
        return;
    s[0] = clothi_dot3(slip, a), s[1] = clothi_dot3(slip, a + 3);
    for (k = 0; k < 3; k++) slip[k] = s[0] * b[k] + s[1] * b[3 + k];
}

CLOTHI_RARE_BEGIN

/* cloth_contact.begin. The first substep of a step makes copies of what is state. */
static cloth_status clothi_contact_begin(void *user, const cloth_eval *e) {
    cloth_collide *c = (cloth_collide *)user;
    const double   start = clothi_now(c->hooks);
    cloth_status   status = CLOTH_OK;
    int            i;
    if (!(e->h > 0))
        return clothi_fail(c->hooks, CLOTH_ERR_UNSUPPORTED,
                           "cloth_solve_static: a sim with contact comes to rest by steps");
    c->h = e->h;
    if (!c->begun) {
        memset(&c->report, 0, sizeof c->report);
        c->begun = 1;
        c->nfailed = c->nnext = c->nnow = c->nholding = 0;
        if (c->seen != clothi_contact_seen(c)) {        /* a host wrote x: anchors are dropped */
            clothi_world_pose(c, c->sim->state.x, 0, 0);
            status = clothi_name_pairs(c, c->exempt, c->nexempt);
            if (!status) status = clothi_contact_check(c);
        } else {
            for (i = 0; i < c->nexempt && !status; i++) status = CLOTHI_PUSH(c, now, c->exempt[i]);
            for (i = 0; i < c->nanchor && !status; i++) status = CLOTHI_PUSH(c, next, c->anchor[i]);
            for (i = 0; i < c->nhold && !status; i++) status = CLOTHI_PUSH(c, holding, c->hold[i]);
        }
    }
    clothi_world_pose(c, e->x_n, e->in->share[0], e->in->share[1]);
    c->ncontact = c->nrow = c->listed = 0;
    c->approach = e->in->squeezed ? CLOTHI_SQUEEZED : CLOTHI_APPROACH;  /* of a tape */
    if (!status) status = clothi_pinch_begin(c, e->in->y ? e->in->y : e->x_n);
    c->report.ms_begin += 1e3 * (clothi_now(c->hooks) - start);
    return status;
}

/* cloth_contact.start. */
static cloth_status clothi_contact_start_at(void *user, const cloth_eval *e, double *x,
                                            double *other, int *impact) {
    cloth_collide *c = (cloth_collide *)user;
    const size_t   bytes = 3 * (size_t)c->nv * sizeof(double);
    cloth_status   status = CLOTH_OK;
    int            rests, hit = 1, i;
    (void)e;
    memcpy(c->x_ie, x, bytes);
    rests = clothi_ends_rest(c);
    if (!rests && !c->nholding) {           /* what passes by without a hit carries nothing */
        clothi_try_guess(c);
        status = clothi_detect(c, 0, &hit);
        c->report.impacts -= hit;           /* those of a guess that is not taken */
    }
    if (!rests && hit && !status) clothi_carried(c, 0);
    if (hit && !status) status = clothi_feasible(c, 0);     /* else it is where it is */
    c->sim->in.squeezed = c->approach < CLOTHI_APPROACH;
    if (status) return status;
    memcpy(x, c->xb, bytes);
    for (i = 0; i < c->nrow; i++) *impact |= c->row[i].multiplier > 0;
    for (i = 0; i < c->nv; i++) *impact |= c->frozen[i] != 0;
    *impact |= c->pinching;
    memcpy(other, x, bytes);
    if (c->nrow && rests) clothi_part_way(c, other);
    return clothi_list_at(c, x);
}

/* What the anchor of contacts q [n] of one key is before its slip is cut: the mean of theirs,
 * weighted by their forces. 0: none pushes. */
static int clothi_anchor_mean(const cloth_collide *c, const clothi_contact *q, int n,
                              clothi_anchor *mean) {
    double u[3];
    int    i, k;
    memset(mean, 0, sizeof *mean);
    mean->key = q->key, mean->gap = HUGE_VAL;
    for (k = 0; k < 3; k++) mean->slip[k] = -0.0;           /* of one contact it is that slip */
    for (i = 0; i < n; i++) {
        if (!(q[i].force > 0)) continue;
        memcpy(u, q[i].last, sizeof u);
        clothi_contact_turn(c, q + i, u);
        for (k = 0; k < 3; k++) mean->slip[k] += q[i].force * u[k];
        mean->force += q[i].force;
        mean->gap = clothi_min(mean->gap, q[i].gap);
    }
    for (k = 0; k < 3 && mean->force > 0; k++) mean->slip[k] /= mean->force;
    return mean->force > 0;
}

/* cloth_contact.close: forces of the contacts at the accepted x, and what the substep leaves to the
 * next one: an anchor for each key with a normal force, its slip cut to the length desc.slip.
 * Sorted, as the contacts are. */
static cloth_status clothi_contact_close(void *user, const double *x, int *impact) {
    cloth_collide *c = (cloth_collide *)user;
    cloth_status   status = CLOTH_OK;
    int            i, j, k;
    memcpy(c->xb, x, 3 * (size_t)c->nv * sizeof(double));
    c->nnext = c->nrow = 0;
    c->iterates = 0;
    clothi_contact_frames(c, x);
    clothi_for(c->hooks, c->ncontact, CLOTHI_CONTACT_GRAIN, clothi_renew_range, c);
    (void)clothi_contact_limits(c, 1, 0);
    for (i = 0; i < c->ncontact && !status; i = j) {
        clothi_anchor a;
        double        size, K[9];
        j = clothi_group_end(c, i);
        for (k = i; k < j; k++) {
            clothi_contact *q = c->contact + k;
            memset(q->tangent, 0, sizeof q->tangent);
            if (q->limit > 0) (void)clothi_contact_friction(c, q, x, q->tangent, K);
            *impact |= q->force > 0 && !(q->start < q->range);
        }
        if (!clothi_anchor_mean(c, c->contact + i, j - i, &a)) continue;
        size = sqrt(clothi_dot3(a.slip, a.slip));
        for (k = 0; k < 3 && size > c->desc.slip; k++) a.slip[k] *= c->desc.slip / size;
        status = CLOTHI_PUSH(c, next, a);
    }
    if (!status) status = clothi_pinch_list(c);
    c->report.contacts = c->ncontact;
    return status;
}

/* cloth_contact.resolve, of leapfrog. */
static cloth_status clothi_contact_resolve(void *user, const cloth_eval *e, double *x, double *v) {
    cloth_collide *c = (cloth_collide *)user;
    cloth_status   status;
    (void)e;
    memcpy(c->x_ie, x, 3 * (size_t)c->nv * sizeof(double));
    status = clothi_feasible(c, 1);
    if (status) return status;
    memcpy(x, c->xb, 3 * (size_t)c->nv * sizeof(double));
    if (c->nrow > 0) status = clothi_zone_speeds(c, v);
    return status || c->until ? status : clothi_pinch_list(c);
}

static void clothi_contact_rollback(void *user, cloth_report *report) {
    cloth_collide *c = (cloth_collide *)user;
    c->begun = 0;
    c->ncontact = c->nrow = c->nholding = 0;    /* the queries know of no last step */
    if (report) report->failed_pairs = c->nfailed;
}

/* cloth_contact.moves: the box of an obstacle's way meets that of a face; a wall; a pinch. */
static int clothi_contact_moves(void *user) {
    cloth_collide *c = (cloth_collide *)user;
    double         way[6], box[6];
    int            o, i, known = 0;         /* the boxes of the cloth's tree                   */
    CLOTHI_OBSTACLES(c, o) {
        clothi_bvh_walk        w = {&c->tree, way, 1, 0, 0};
        const clothi_obstacle *b = c->obstacle + o;
        const double          *p = clothi_pose(b, 0), *q = clothi_pose(b, 1);
        if (!memcmp(p, q, 3 * (size_t)b->nv * sizeof *p) &&
            !memcmp(b->turn[0], b->turn[1], sizeof b->turn[0]))
            continue;
        if (clothi_is_wall(b)) return 1;
        for (i = 0; i < b->nv; i++) {
            clothi_swept_boxes(1, p + 3 * i, q + 3 * i, b->thickness + b->radius, box);
            clothi_box_join(i ? way : box, box, way);
        }
        if (!known++) clothi_tree_boxes(c, &c->tree, c->sim->state.x, NULL, 0);
        if (clothi_bvh_next(&w) >= 0) return 1;
    }
    return c->nhold > 0 || (c->begun && c->nholding > 0);
}

/* Poses, and what the step under way has made of anchors, exempt pairs and holds, become state. */
static void clothi_contact_commit(void *user, cloth_report *report) {
    cloth_collide *c = (cloth_collide *)user;
    double         least = c->thickest;
    int            i, active = 0;
    CLOTHI_OBSTACLES(c, i) {
        clothi_obstacle *b = c->obstacle + i;
        clothi_go(clothi_pose(b, 0), clothi_pose(b, 1), 3 * b->nv, c->sim->fraction);
        clothi_turn_part(b->turn[0], b->turn[1], c->sim->fraction, b->turned[1]);
        memcpy(b->turn[0], b->turned[1], sizeof b->turn[0]);
    }
    if (c->begun) {                         /* not of a sim that sleeps */
        CLOTHI_TAKE(clothi_anchor, c, anchor, next);
        CLOTHI_TAKE(cloth_hold, c, hold, holding);
        c->report.held = c->nhold;
        for (i = 0; i < c->mf && c->nhold; i++) c->report.exempt_faces += c->pinched[i];
        clothi_exempt_part(c);
        clothi_exempt_accept(c);
        memcpy(c->x_last, c->xb, 3 * (size_t)c->nw * sizeof(double));
        c->begun = 0;
        c->inexact = report->outcome == CLOTH_STEP_MAX_ITERATIONS;
    }
    for (i = 0; i < c->ncontact; i++) {
        active += c->contact[i].force > 0;
        if (!c->contact[i].soft) least = clothi_min(least, c->contact[i].gap);
    }
    for (i = 0; i < c->nrow; i++) {         /* of LEAPFROG */
        const clothi_pair_id p = {c->row[i].kind, c->row[i].a, c->row[i].b};
        active += c->row[i].impulse > 0;
        least = clothi_min(least, clothi_pair_gap(c, c->xb, &p));
    }
    c->report.exempt_pairs = c->nexempt;
    c->report.fraction = c->sim->fraction;
    report->contacts = active;
    report->exempt_pairs = c->nexempt;
    report->failed_pairs = 0;
    report->smallest_gap = least;
}

/* cloth_contact.balance: work of the contacts over the substep, at its end. */
static void clothi_contact_balance(void *user, cloth_ledger *ledger) {
    const cloth_collide *c = (const cloth_collide *)user;
    int                  i, j, k;
    ledger->contact = 0;                    /* J, without their damping */
    for (i = 0; i < c->ncontact; i = j) {
        double part = 0;
        for (j = clothi_group_end(c, i), k = i; k < j; k++)
            part += clothi_eighth(c->contact[k].share *
                                  clothi_elastic_energy(c->contact + k, c->contact[k].gap));
        ledger->contact += sqrt(sqrt(sqrt(part)));
    }
    for (i = 0; i < c->ncontact && c->begun; i++) {
        const clothi_contact *q = c->contact + i;
        double                loss = clothi_dot3(q->tangent, q->carry), work = 0;
        for (j = 0; j < q->n; j++)
            for (k = 0; k < 3; k++) {
                const double dx = c->xb[3 * q->v[j] + k] - c->xa[3 * q->v[j] + k];
                loss += q->w[j] * q->tangent[k] * dx;
                if (q->v[j] < c->nv)
                    work += q->w[j] * (q->force * q->normal[k] - q->tangent[k]) * dx;
            }
        ledger->friction_loss += loss;
        ledger->contact_work += work + loss;
    }
    for (i = 0; i < c->nholding && c->begun; i++) {
        const int v = 3 * c->holding[i].vertex;
        double    pull[3], dx[3], hess[9];
        (void)clothi_hold_pull(c, c->holding + i, c->xb + v, pull, hess);
        clothi_sub3(c->xb + v, c->xa + v, dx);
        ledger->contact_work -= clothi_dot3(pull, dx);
    }
    for (i = 0; i < c->nrow; i++) {         /* LEAPFROG: rows push at the speed of obstacles */
        const double work = c->row[i].impulse * c->row[i].speed;
        ledger->contact_work += work, ledger->zone_loss += work;
    }
}

/* --- options --- */

#define CLOTHI_MOST_PASSES     1000000
#define CLOTHI_FINEST          1e-12        /* of the largest coordinate: thickness            */
#define CLOTHI_FARTHEST        1e50         /* m, of a coordinate                              */
#define CLOTHI_THICKEST        1e9          /* m                                               */
#define CLOTHI_ROUNDEST        5e5          /* of the thickness, a radius: arrivals of [4.1] are
                                               known to 1e-6 of it                             */
#define CLOTHI_ROUGHEST        1e3          /* coefficient of friction; at 1e6 it made energy  */
#define CLOTHI_COLLIDE_COOKIE  0xC0111DEu
#define CLOTHI_OBSTACLE_COOKIE 0x0B57AC1Eu

CLOTH_API cloth_collide_desc cloth_collide_desc_default(void) {
    cloth_collide_desc d;
    memset(&d, 0, sizeof d);
    d.cookie = CLOTHI_COLLIDE_COOKIE;
    d.thickness = 2e-3;
    d.relaxation = 0.02;
    d.friction = 0.3;
    d.slip = 1e-5;
    d.max_passes = 40;
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

/* --- snapshot --- */

typedef struct clothi_contact_head {
    uint64_t seen, kind;
    int32_t  nanchor, nexempt, npose, nhold;
} clothi_contact_head;

/* What a snapshot does not hold and must find again: the obstacles' kinds and shapes, the desc. */
static uint64_t clothi_contact_kind(const cloth_collide *c) {
    const cloth_collide_desc *d = &c->desc;
    const double              number[7] = {d->thickness, c->stiffness, d->relaxation, d->friction,
                                           d->slip, (double)d->max_passes,
                                           (double)d->initial};
    uint64_t                  h = clothi_hash(0xcbf29ce484222325u, number, sizeof number);
    int                       o;
    for (o = 0; o < d->nparts; o++) {
        const cloth_collide_part *q = c->part + o;
        const uint32_t            bits[3] = {q->self ? 1u : 0u, q->category, q->mask};
        h = clothi_hash(clothi_hash(h, bits, sizeof bits), &q->friction, sizeof q->friction);
    }
    for (o = 0; o < c->nobstacle; o++) {
        const clothi_obstacle *b = c->obstacle + o;
        const double           real[5] = {b->radius, b->thickness, b->normal[0], b->normal[1],
                                          b->normal[2]};
        const uint32_t         whole[7] = {(uint32_t)o, (uint32_t)b->kind, (uint32_t)b->nv,
                                           (uint32_t)b->nf, b->category, b->mask,
                                           b->self_penetrating ? 1u : 0u};
        if (!b->used) continue;
        h = clothi_hash(h, whole, sizeof whole);
        h = clothi_hash(h, real, sizeof real);
        h = clothi_hash(h, &b->shape, sizeof b->shape);
    }
    return h;
}

/* What is behind a snapshot's head, by a walk over it: poses, then as many anchors, holds and pairs
 * as the head says, which is told how many numbers the poses are. Returns the bytes of all; pairs
 * end where a double may begin. */
static size_t clothi_contact_walk(cloth_collide *c, int verb, const void *buf,
                                  clothi_contact_head *head) {
    clothi_walk w;
    int         o;
    memset(&w, 0, sizeof w);
    w.verb = verb, w.buf = (unsigned char *)(uintptr_t)buf, w.at = sizeof *head;
    CLOTHI_OBSTACLES(c, o) {
        clothi_obstacle *b = c->obstacle + o;
        clothi_walk_bytes(&w, (unsigned char *)b->x, 6 * (size_t)b->nv * sizeof *b->x);
        clothi_walk_bytes(&w, (unsigned char *)b->turn, sizeof b->turn);
        clothi_walk_bytes(&w, (unsigned char *)b->surface, sizeof b->surface);
        clothi_walk_bytes(&w, (unsigned char *)&b->friction, sizeof b->friction);
    }
    head->npose = (int32_t)((w.at - sizeof *head) / sizeof(double));
    clothi_walk_bytes(&w, (unsigned char *)c->anchor, (size_t)head->nanchor * sizeof *c->anchor);
    clothi_walk_bytes(&w, (unsigned char *)c->hold, (size_t)head->nhold * sizeof *c->hold);
    clothi_walk_bytes(&w, (unsigned char *)c->exempt, (size_t)head->nexempt * sizeof *c->exempt);
    return w.at + (size_t)(head->nexempt % 2) * sizeof *c->exempt;
}

/* The head of a snapshot now, but for its kind; returns the bytes of all. */
static size_t clothi_contact_now(cloth_collide *c, clothi_contact_head *head) {
    memset(head, 0, sizeof *head);
    head->seen = c->seen;
    head->nanchor = c->nanchor, head->nexempt = c->nexempt, head->nhold = c->nhold;
    return clothi_contact_walk(c, CLOTHI_SIZE, NULL, head);
}

static size_t clothi_contact_save_size(void *user) {
    clothi_contact_head head;
    return clothi_contact_now((cloth_collide *)user, &head);
}

static void clothi_contact_save(void *user, void *buf) {
    cloth_collide      *c = (cloth_collide *)user;
    clothi_contact_head head;
    memset(buf, 0, clothi_contact_now(c, &head));
    head.kind = clothi_contact_kind(c);
    memcpy(buf, &head, sizeof head);
    (void)clothi_contact_walk(c, CLOTHI_SAVE, buf, &head);
}

/* Obstacle `slot` is there. */
static int clothi_slot_valid(const cloth_collide *c, int slot) {
    return slot >= 0 && slot < c->nobstacle && c->obstacle[slot].used;
}

/* What a snapshot's poses and lists, at `in`, say or name that cannot be, or not in order; else
 * NULL. */
static const char *clothi_contact_forged(const cloth_collide *c, const clothi_contact_head *head,
                                         const unsigned char *in) {
    const int      most[3] = {c->nv, c->me, c->nf}, sides = 2 * c->sim->model->nparts;
    const char    *fault = NULL;
    clothi_anchor  a, last;
    cloth_hold     h;
    clothi_pair_id p, before;
    double         x;
    int            i, k, there;
    CLOTHI_OBSTACLES(c, k)                  /* friction is the last number of each */
        for (i = 6 * c->obstacle[k].nv + 24; i >= 0; i--, in += sizeof x) {
            memcpy(&x, in, sizeof x);
            if (!(fabs(x) <= CLOTHI_FARTHEST) || (i == 0 && !(x >= 0 && x <= CLOTHI_ROUGHEST)))
                fault = "has a pose, a surface or a friction that cannot be";
        }
    for (i = 0; i < head->nanchor; i++, last = a, in += sizeof a) {
        memcpy(&a, in, sizeof a);
        if (a.key.feature < 0 || a.key.feature > 2 || a.key.a < 0 ||
            a.key.a >= most[a.key.feature] ||
            !(a.key.cloth == 0 ? clothi_slot_valid(c, a.key.b)
                               : a.key.cloth == 1 && a.key.b >= 0 && a.key.b < sides) ||
            !clothi_finite(a.force) || !clothi_finite(a.gap) ||
            clothi_find_nonfinite(a.slip, 3) >= 0 || (i > 0 && clothi_order(&last, &a, 4) >= 0))
            fault = "has an anchor of contact that is not there, or not a number";
    }
    for (i = 0; i < head->nhold; i++, in += sizeof h) {
        memcpy(&h, in, sizeof h);
        there = h.vertex >= 0 && h.vertex < c->nv && clothi_slot_valid(c, h.slot) &&
                c->star[h.vertex] < c->star[h.vertex + 1] &&
                c->obstacle[h.slot].self_penetrating && clothi_finite(h.share);
        for (k = 0; k < 2 && there; k++)
            there = h.face[k] >= 0 && h.face[k] < c->obstacle[h.slot].nf &&
                    clothi_find_nonfinite(h.weight[k], 3) < 0;
        if (!there) fault = "holds a vertex that is not there";
    }
    for (i = 0, memset(&before, 0, sizeof before); i < head->nexempt;
         i++, before = p, in += sizeof p) {
        memcpy(&p, in, sizeof p);
        there = p.kind == CLOTHI_FF   ? p.a < p.b && p.b < c->mf
                : p.kind == CLOTHI_VF ? p.a < c->nw && p.b < c->mf
                : p.kind == CLOTHI_EE ? p.a < c->me && p.b < c->me
                : p.kind == CLOTHI_VP ? p.a < c->nv && clothi_slot_valid(c, p.b) &&
                                            clothi_is_wall(c->obstacle + p.b)
                                      : 0;
        if (!there || p.a < 0 || p.b < 0 || (i > 0 && clothi_order(&before, &p, 3) >= 0))
            fault = "exempts a pair that is not there";
    }
    return fault;
}

/* A snapshot of these obstacles, whole; then there is room for it. */
static cloth_status clothi_contact_unsaved(void *user, const void *buf, size_t size) {
    cloth_collide      *c = (cloth_collide *)user;
    clothi_contact_head head, now;
    const char         *fault;
    cloth_status        status;
    (void)clothi_contact_now(c, &now);
    memset(&head, 0, sizeof head);
    if (size >= sizeof head) memcpy(&head, buf, sizeof head);
    if (size < sizeof head || head.npose != now.npose || head.nanchor < 0 ||
        head.nexempt < 0 || head.nhold < 0 || head.kind != clothi_contact_kind(c) ||
        size != clothi_contact_walk(c, CLOTHI_SIZE, NULL, &head))
        return clothi_fail(c->hooks, CLOTH_ERR_FORMAT, "collide: the snapshot has other obstacles, "
                           "or another cloth_collide_desc, than this sim");
    fault = clothi_contact_forged(c, &head, (const unsigned char *)buf + sizeof head);
    if (fault)
        return clothi_fail(c->hooks, CLOTH_ERR_FORMAT, "collide: the snapshot %s", fault);
    status = CLOTHI_ROOM(c, anchor, head.nanchor);
    if (!status) status = CLOTHI_ROOM(c, hold, head.nhold);
    return status ? status : CLOTHI_ROOM(c, exempt, head.nexempt);
}

/* Bytes of all that a collide owns; frees it too, but for *c itself. */
static size_t clothi_contact_blocks(cloth_collide *c, int release) {
    const void *const block[] = {
        c->vertex_part, c->hold, c->holding, c->found.pair, c->zone, c->zone_order, c->qp_val,
        c->contact, c->spare, c->order, c->row, c->pair, c->anchor, c->next, c->exempt,
        c->now, c->failed, c->obstacle};
    size_t sum = clothi_block_size(c) + clothi_world_blocks(c, release ? c->hooks : NULL);
    int    o;
    for (o = 0; o < c->nobstacle; o++) {
        clothi_obstacle *b = c->obstacle + o;
        sum += clothi_block_size(b->x) + clothi_block_size(b->faces);
        if (release) clothi_obstacle_free(c->hooks, b);
    }
    for (o = 0; c->work && o < c->nwork; o++) {
        sum += cloth_qp_work_bytes(c->work[o]);
        if (release) cloth_qp_work_destroy(c->work[o]);
    }
    return sum + clothi_blocks(release ? c->hooks : NULL, block, sizeof block / sizeof *block);
}

/* The queries know of no last step. */
static void clothi_contact_forget(cloth_collide *c) {
    c->begun = 0;
    c->ncontact = c->nrow = c->nfailed = 0;
    memset(&c->report, 0, sizeof c->report);
}

static void clothi_contact_load(void *user, const void *buf) {
    cloth_collide      *c = (cloth_collide *)user;
    clothi_contact_head head;
    memcpy(&head, buf, sizeof head);
    clothi_contact_forget(c);
    c->nanchor = head.nanchor, c->nexempt = head.nexempt, c->nhold = head.nhold;
    (void)clothi_contact_walk(c, CLOTHI_LOAD, buf, &head);
    c->report.exempt_pairs = c->nexempt, c->report.held = c->nhold;
    c->seen = head.seen;
}

/* No rotation. By a loop: gcc 12 for AVX-512 copies the 1, 0, 0, 0 of a constant as 1, 1, 1, 1. */
static void clothi_no_turn(double turn[2][9]) {
    int i;
    for (i = 0; i < 18; i++) turn[i / 9][i % 9] = i % 9 % 4 == 0;
}

/* Obstacles go back to where they were added. */
static void clothi_contact_reset(void *user) {
    cloth_collide *c = (cloth_collide *)user;
    int            o;
    clothi_contact_forget(c);
    c->nanchor = c->nexempt = c->nhold = 0;
    c->seen = 0;
    CLOTHI_OBSTACLES(c, o) {
        clothi_obstacle *b = c->obstacle + o;
        memcpy(clothi_pose(b, 0), clothi_pose(b, 2), 3 * (size_t)b->nv * sizeof(double));
        memcpy(clothi_pose(b, 1), clothi_pose(b, 2), 3 * (size_t)b->nv * sizeof(double));
        clothi_no_turn(b->turn);
        memset(b->surface, 0, sizeof b->surface);
        b->friction = b->first_friction;
    }
}

static size_t clothi_contact_bytes(void *user) {
    return clothi_contact_blocks((cloth_collide *)user, 0);
}

/* --- create --- */

/* m, of coordinates of obstacles and, where one is as thin as `thickness`, of the cloth: there
 * areas' squares have room and rounding keeps the thickness. */
static double clothi_farthest_place(double thickness) {
    return clothi_min(CLOTHI_FARTHEST, thickness / CLOTHI_FINEST);
}

/* x [n x 3]: finite, at most `most`. */
static cloth_status clothi_check_places(const cloth_hooks *hooks, const char *call,
                                        const char *name, const double *x, int n, double most) {
    size_t i, size = 3 * (size_t)n;
    for (i = 0; i < size && fabs(x[i]) <= most; i++) continue;
    if (i == size) return CLOTH_OK;
    return clothi_fail(hooks, clothi_finite(x[i]) ? CLOTH_ERR_ARGUMENT : CLOTH_ERR_NONFINITE,
                       "%s%s[%i] = %g must be finite, at most %g", call, name, (int)i, x[i], most);
}

static cloth_status clothi_collide_check(const cloth_sim *sim, const cloth_collide_desc *d) {
    static const clothi_rule rule[] = {
        CLOTHI_RULE(cloth_collide_desc, thickness, 1, CLOTHI_OVER, 0, CLOTHI_THICKEST),
        CLOTHI_RULE(cloth_collide_desc, stiffness, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_collide_desc, relaxation, 1, 0, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_collide_desc, friction, 1, 0, 0, CLOTHI_ROUGHEST),
        CLOTHI_RULE(cloth_collide_desc, slip, 1, CLOTHI_OVER, 0, CLOTHI_HUGE),
        CLOTHI_RULE(cloth_collide_desc, max_passes, 0, 0, 1, CLOTHI_MOST_PASSES),
        CLOTHI_RULE(cloth_collide_desc, initial, 0, 0, CLOTH_INITIAL_REFUSE,
                    CLOTH_INITIAL_EXEMPT)};
    const cloth_hooks *hooks = &sim->hooks;
    const double       big = clothi_max_abs(sim->state.x, 3 * sim->model->nv);
    char               name[32];
    cloth_status       status;
    int                i;
    if (d->cookie != CLOTHI_COLLIDE_COOKIE)
        return clothi_fail(hooks, CLOTH_ERR_UNINIT, "collide: not by cloth_collide_desc_default()");
    status = clothi_check_rules(hooks, "collide.", d, rule, sizeof rule / sizeof *rule);
    if (status) return status;
    if (d->thickness < CLOTHI_FINEST * big)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "collide.thickness = %g is lost in the rounding of x = %g",
                           d->thickness, big);
    if (d->nparts != 0 && (d->nparts != sim->model->nparts || !d->parts))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "collide.nparts = %i, the model has %i%s",
                           d->nparts, sim->model->nparts, d->parts ? "" : "; parts is NULL");
    for (i = 0; i < d->nparts && !status; i++)
        status = clothi_check_range(hooks, clothi_member(name, "collide.parts", i), "friction",
                                    d->parts[i].friction, 0, CLOTHI_ROUGHEST, 0);
    if (status) return status;
    if (sim->model->desc.contact == CLOTH_CONTACT_NONE)
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED,
                           "cloth_collide_create: the model's desc.contact is CLOTH_CONTACT_NONE");
    if (sim->contact_on)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_collide_create: the sim has a contact already");
    return CLOTH_OK;
}

static cloth_status clothi_collide_arrays(cloth_collide *c) {
    const size_t nv = (size_t)c->nv, one = sizeof(int), real = sizeof(double);
    const clothi_array need[] = {
        {&c->vertex_part, nv, one}, {&c->x_ie, 3 * nv, real},
        {&c->tied, c->sim->model->tie ? 3 * nv : 0, real},
        {&c->x_list, 3 * nv, real}, {&c->x_frame, 3 * nv, real}, {&c->way, 3 * nv, real},
        {&c->frozen, nv, 1}, {&c->zone_of, nv, one},
        {&c->zone_number, nv, one}, {&c->local, nv, one}, {&c->member, nv, one},
        {&c->qp_minv, 3 * nv, real}, {&c->qp_x0, 3 * nv, real}, {&c->qp_x, 3 * nv, real},
        {&c->held_of, nv, one}, {&c->look, nv, 1}, {&c->caught, nv, sizeof *c->caught},
        {&c->hold_to, 3 * nv, real}, {&c->hold_by, 3 * nv, real},
        {&c->work, (size_t)c->nwork, sizeof *c->work},
        {&c->part, (size_t)c->desc.nparts, sizeof *c->part}};
    return clothi_arrays(c->hooks, need, sizeof need / sizeof *need);
}

/* cloth_contact.orphan: all goes that was counted by the sim; *c waits for its destruction. */
static void clothi_contact_orphan(void *user) {
    cloth_collide *c = (cloth_collide *)user;
    int            i;
    for (i = 0; i < c->sim->model->desc.max_attachments; i++)
        if (c->sim->attach[i].on > 0) c->sim->attach[i].on = 0;         /* it stays there      */
    c->last = c->sim->model->hooks;
    (void)clothi_contact_blocks(c, 1);
    c->sim = NULL;
}

static int clothi_contact_list(void *user, int max, void *contact) {
    int n = 0;
    (void)cloth_collide_contacts((const cloth_collide *)user, max,
                                 (cloth_collide_contact *)contact, &n);
    return n;
}

static void clothi_collide_connect(cloth_collide *c);

/* Outside a step: what a host wrote into x is a number. */
static cloth_status clothi_look_check(const cloth_collide *c) {
    return clothi_check_places(c->hooks, "the state", "'s x", c->sim->state.x, c->nv,
                               CLOTHI_FARTHEST);
}

/* c->now and x become state outside a step. Where x is another than it was, nothing sticks or is
 * held there. */
static void clothi_look_accept(cloth_collide *c) {
    const uint64_t seen = c->seen;
    clothi_exempt_accept(c);
    if (c->seen != seen) c->nanchor = c->nhold = 0;
    c->report.exempt_pairs = c->nexempt, c->report.held = c->nhold;
}

/* Checks where everything is now, outside a step: what it finds becomes state. */
static cloth_status clothi_collide_look(cloth_collide *c) {
    cloth_status status = clothi_look_check(c);
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    if (!status) status = clothi_contact_check(c);
    if (status) return status == CLOTH_ERR_STEP ? CLOTH_ERR_MESH : status;
    clothi_look_accept(c);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_create(cloth_sim *sim, const cloth_collide_desc *desc,
                                            cloth_collide **out) {
    cloth_collide_desc d;
    cloth_collide     *c;
    cloth_status       status;
    double             area = 0;
    int                i;
    if (!out) return CLOTH_ERR_ARGUMENT;
    *out = NULL;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    d = desc ? *desc : cloth_collide_desc_default();
    status = clothi_collide_check(sim, &d);
    if (status) return status;
    c = (cloth_collide *)clothi_alloc(&sim->hooks, 1, sizeof *c);
    if (!c) return CLOTH_ERR_MEMORY;
    c->sim = sim;
    c->hooks = &sim->hooks;
    c->desc = d;
    c->desc.parts = NULL;
    c->self = sim->model->desc.contact == CLOTH_CONTACT_SELF;
    c->nv = sim->model->nv, c->nf = sim->model->nf;
    for (i = 0; i < c->nf; i++) area += clothi_rest_area(sim->params.X, i);
    c->mean_area = area / c->nv;
    c->stiffness = d.stiffness;             /* Pa/m: 30 times the weight rests at k t/4, at t/2 */
    if (!(d.stiffness > 0))
        c->stiffness = 30 * 9.81 * sim->total / area / (0.25 * d.thickness);
    c->nwork = sim->hooks.parallel.run ? sim->hooks.parallel.max_workers : 1;
    status = clothi_collide_arrays(c);
    if (!status) {
        if (d.nparts) memcpy(c->part, d.parts, (size_t)d.nparts * sizeof *d.parts);
        for (i = 0; i < 3 * c->nf; i++)
            c->vertex_part[sim->model->faces[i]] = sim->model->part[i / 3];
        status = clothi_world_build(c);
    }
    for (i = 0; i < c->nwork && !status; i++) status = cloth_qp_work_create(c->hooks, c->work + i);
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
    cloth_hooks last;
    if (!c) return;
    if (c->sim) {
        c->sim->contact_on = 0, c->sim->still = 0;
        clothi_contact_orphan(c);
    }
    last = c->last;
    clothi_free(&last, c);
}

/* --- obstacles: add, remove, move --- */

/* An obstacle came, went, or is somewhere else at once: that ends a tape. */
static void clothi_tape_break(const cloth_sim *s) {
    if (s->tape_gone) s->recorder.step(s->recorder.user, NULL);
}

/* An obstacle comes or goes: a new world, looked at. What was found at the last step names the old
 * one and goes with it. On failure all is as before. */
static cloth_status clothi_world_change(cloth_collide *c, clothi_obstacle *o) {
    cloth_status  status = clothi_name_pairs(c, c->exempt, c->nexempt);
    cloth_collide old = *c, none;
    if (status) return status;
    memset(&none, 0, sizeof none);
    o->used = !o->used;
    clothi_world_take(c, &none);
    status = clothi_world_build(c);
    if (!status) status = clothi_collide_look(c);
    (void)clothi_world_blocks(status ? c : &old, c->hooks);
    if (status) {
        if (status != CLOTH_ERR_MESH) c->nfailed = 0;   /* else what intersects */
        o->used = !o->used;
        clothi_world_take(c, &old);
        (void)clothi_world_count(c);
        clothi_world_edges(c);
        return status;
    }
    c->sim->still = 0;                      /* wakes */
    c->ncontact = c->nrow = c->nfailed = 0;
    clothi_tape_break(c->sim);
    return CLOTH_OK;
}

/* Numbers of vertices and faces that a desc of its kind has. */
static int clothi_obstacle_shape(const cloth_obstacle_desc *d, int *nf) {
    static const int nv[7] = {0, 0, 1, 2, 1, 8, 1};         /* by kind; MESH: as it says */
    *nf = d->kind == CLOTH_OBSTACLE_MESH ? d->nf : d->kind == CLOTH_OBSTACLE_BOX ? 12 : 0;
    return d->kind == CLOTH_OBSTACLE_MESH ? d->nv : nv[d->kind];
}

static int clothi_has_radius(cloth_obstacle_kind kind) {
    return kind == CLOTH_OBSTACLE_SPHERE || kind == CLOTH_OBSTACLE_CAPSULE ||
           kind == CLOTH_OBSTACLE_GRID;
}

/* A body that penetrates itself has an inside: closed, manifold, its faces turned outwards. Of
 * others it is said where they are closed and inside out: a room, or a slip. */
static cloth_status clothi_obstacle_closed(const cloth_hooks *hooks, const cloth_obstacle_desc *d) {
    clothi_surface_defects defect;
    cloth_status status = clothi_surface_check(hooks, d->nv, d->nf, d->x, d->faces, NULL, &defect);
    const int    open = defect.open >= 0, turned = defect.turned >= 0;
    const int    at = turned ? defect.turned : open ? defect.open : defect.branch;
    if (status) return status;
    if (!d->self_penetrating && defect.inward >= 0 && defect.volume < 0)
        clothi_say(hooks, CLOTH_LOG_WARNING, CLOTH_OK, "obstacle.faces: the closed part of face %i "
                   "looks inwards, as a room does; cloth_mesh_orient turns it", defect.inward);
    if (!d->self_penetrating) return CLOTH_OK;
    if (at >= 0)
        return clothi_fail(hooks, CLOTH_ERR_MESH, "obstacle.self_penetrating: face %i %s at corner "
                           "%i", at / 3, turned ? "is turned against its neighbour" : open ?
                           "is open" : "shares an edge with more than one other", at % 3);
    if (defect.inward < 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_MESH, "obstacle.self_penetrating: the part of face %i is "
                       "inside out, its faces look inwards", defect.inward);
}

/* What is said of a grid, of which a potential is all that there is. */
static cloth_status clothi_obstacle_check_grid(const cloth_collide *c,
                                               const cloth_obstacle_desc *d) {
    static const char *const count[3] = {"n[0]", "n[1]", "n[2]"};
    const cloth_hooks *hooks = c->hooks;
    const cloth_grid  *g = d->grid;
    const double       t = d->thickness > 0 ? d->thickness : c->desc.thickness;
    cloth_status       status;
    ptrdiff_t          at;
    if (!g || !g->phi) return clothi_null(hooks, g ? "obstacle.grid->phi" : "obstacle.grid");
    status = clothi_check_vector(hooks, "obstacle.grid->origin", g->origin, 3);
    if (!status)
        status = clothi_check_range(hooks, "obstacle.grid->", "cell", g->cell, 0, HUGE_VAL,
                                    CLOTHI_OVER);
    if (!status)
        status = clothi_check_range(hooks, "obstacle.grid->", "band", g->band, d->radius + t,
                                    HUGE_VAL, CLOTHI_OVER);
    for (at = 0; at < 3 && !status; at++)
        status = clothi_check_count(hooks, "obstacle.grid->", count[at], g->n[at], 2, 0x7fffffff);
    if (status) return status;
    at = clothi_find_nonfinite(g->phi, (size_t)g->n[0] * (size_t)g->n[1] * (size_t)g->n[2]);
    if (at >= 0)
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "obstacle.grid->phi[%i] = %g", (int)at,
                           g->phi[at]);
    if (c->sim->model->desc.integrator != CLOTH_INTEGRATOR_LEAPFROG) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "obstacle.kind = %i: leapfrog has no "
                       "proximity potential, which is all that a grid has", (int)d->kind);
}

static cloth_status clothi_obstacle_check(const cloth_collide *c, const cloth_obstacle_desc *d) {
    static const clothi_rule rule[] = {
        CLOTHI_RULE(cloth_obstacle_desc, friction, 1, 0, 0, CLOTHI_ROUGHEST),
        CLOTHI_RULE(cloth_obstacle_desc, thickness, 1, 0, 0, CLOTHI_THICKEST)};
    const cloth_hooks *hooks = c->hooks;
    const int          grid = d->kind == CLOTH_OBSTACLE_GRID;
    const double       t = d->thickness > 0 ? d->thickness : c->desc.thickness;
    const double       big = clothi_max_abs(c->sim->state.x, 3 * c->nv);
    cloth_status       status;
    int                nf, nv;
    if (d->cookie != CLOTHI_OBSTACLE_COOKIE)
        return clothi_fail(hooks, CLOTH_ERR_UNINIT,
                           "obstacle: not by cloth_obstacle_desc_default()");
    status = clothi_check_count(hooks, "obstacle.", "kind", (int)d->kind, CLOTH_OBSTACLE_MESH,
                                CLOTH_OBSTACLE_GRID);
    if (status) return status;
    nv = clothi_obstacle_shape(d, &nf);
    status = clothi_check_count(hooks, "obstacle.", "nv", nv, 1, CLOTH_MAX_COUNT);
    if (!status && !d->x) status = clothi_null(hooks, "obstacle.x");
    if (!status) status = clothi_check_rules(hooks, "obstacle.", d, rule, 2);
    if (!status && d->thickness > 0 && t < CLOTHI_FINEST * big)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "obstacle.thickness = %g is lost in the rounding of x = %g", t, big);
    if (!status) status = clothi_check_places(hooks, "obstacle", ".x", d->x, nv,
                                              clothi_farthest_place(t));
    if (!status && clothi_has_radius(d->kind))
        status = clothi_check_range(hooks, "obstacle.", "radius", d->radius, 0,
                                    CLOTHI_ROUNDEST * t, grid ? 0 : CLOTHI_OVER);
    if (status) return status;
    if (d->kind == CLOTH_OBSTACLE_PLANE) {
        status = clothi_check_vector(hooks, "obstacle.normal", d->normal, 3);
        if (status) return status;
        if (!(clothi_max_abs(d->normal, 3) > 0))
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "obstacle.normal = (%g, %g, %g)",
                               d->normal[0], d->normal[1], d->normal[2]);
    }
    if (grid) return clothi_obstacle_check_grid(c, d);
    if (d->kind != CLOTH_OBSTACLE_MESH) return CLOTH_OK;
    if (d->self_penetrating && c->sim->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG)
        return clothi_fail(hooks, CLOTH_ERR_UNSUPPORTED, "obstacle.self_penetrating = %i: leapfrog "
                           "has no pull, which is all that cloth in a pinch has",
                           d->self_penetrating);
    status = clothi_check_count(hooks, "obstacle.", "nf", nf, 1, CLOTH_MAX_COUNT);
    if (!status && !d->faces) status = clothi_null(hooks, "obstacle.faces");
    if (!status) status = clothi_check_faces(hooks, nv, nf, d->faces);
    return status ? status : clothi_obstacle_closed(hooks, d);
}

static cloth_status clothi_obstacle_fill(cloth_collide *c, clothi_obstacle *o,
                                         const cloth_obstacle_desc *d) {
    double       normal[3], big = clothi_max_abs(d->normal, 3), size;
    int          k;
    for (k = 0; k < 3; k++) normal[k] = big > 0 ? d->normal[k] / big : 0;
    size = sqrt(clothi_dot3(normal, normal));
    o->kind = d->kind;
    o->nv = clothi_obstacle_shape(d, &o->nf);
    o->x = (double *)clothi_alloc(c->hooks, 9 * (size_t)o->nv, sizeof(double));
    o->faces = (int *)clothi_copy(c->hooks, d->kind == CLOTH_OBSTACLE_BOX ? clothi_box_faces
                                                                          : d->faces,
                                  3 * (size_t)o->nf, sizeof(int));
    if (!o->x || !o->faces) return CLOTH_ERR_MEMORY;
    for (k = 0; k < 3; k++) {
        memcpy(clothi_pose(o, k), d->x, 3 * (size_t)o->nv * sizeof(double));
        o->normal[k] = d->kind == CLOTH_OBSTACLE_PLANE ? normal[k] / size : 0;
    }
    o->shape = clothi_hash(0, d->x, 3 * (size_t)o->nv * sizeof(double));
    o->shape = clothi_hash(o->shape, o->faces, 3 * (size_t)o->nf * sizeof(int));
    o->grid = d->kind == CLOTH_OBSTACLE_GRID ? d->grid : NULL;
    if (o->grid) {
        const int   *n = o->grid->n;
        const double span[2] = {o->grid->cell, o->grid->band};
        o->shape = clothi_hash(o->shape, n, sizeof o->grid->n);
        o->shape = clothi_hash(o->shape, o->grid->origin, sizeof o->grid->origin);
        o->shape = clothi_hash(o->shape, span, sizeof span);
        o->shape = clothi_hash(o->shape, o->grid->phi,
                               (size_t)n[0] * (size_t)n[1] * (size_t)n[2] * sizeof(double));
    }
    o->radius = clothi_has_radius(d->kind) ? d->radius : 0;
    o->friction = o->first_friction = d->friction;
    o->category = d->category, o->mask = d->mask;
    o->thickness = d->thickness > 0 ? d->thickness : c->desc.thickness;
    clothi_no_turn(o->turn);
    o->self_penetrating = d->kind == CLOTH_OBSTACLE_MESH && d->self_penetrating;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_add(cloth_collide *c, const cloth_obstacle_desc *desc,
                                         cloth_obstacle *id) {
    clothi_obstacle *o;
    cloth_status     status;
    int              slot = 0, known;
    if (id) id->id = 0;
    if (!c) return CLOTH_ERR_ARGUMENT;
    if (!desc) return clothi_null(c->hooks, "cloth_collide_add: desc");
    known = c->nobstacle;
    status = clothi_obstacle_check(c, desc);
    if (status) return status;
    while (slot < c->nobstacle && c->obstacle[slot].used) slot++;
    status = CLOTHI_ROOM(c, obstacle, slot + 1);
    if (status) return status;
    if (slot == c->nobstacle) c->nobstacle++;
    o = c->obstacle + slot;
    status = clothi_obstacle_fill(c, o, desc);
    if (!status) status = clothi_world_change(c, o);
    if (status) {
        clothi_obstacle_free(c->hooks, o);
        c->nobstacle = known;
        return status;
    }
    o->generation++;
    if (id) *id = clothi_obstacle_id(c, slot);
    return CLOTH_OK;
}

/* What friction and pinches remember of one obstacle; features of the cloth keep their numbers. */
static void clothi_obstacle_forget(cloth_collide *c, int slot) {
    int i, n = 0;
    for (i = 0; i < c->nanchor; i++)
        if (c->anchor[i].key.cloth || c->anchor[i].key.b != slot) c->anchor[n++] = c->anchor[i];
    c->nanchor = n;
    for (i = n = 0; i < c->nhold; i++)
        if (c->hold[i].slot != slot) c->hold[n++] = c->hold[i];
    c->nhold = c->report.held = n;
}

/* What is attached to an obstacle aims at its target, at_once: is there; or is gone with it. */
static cloth_status clothi_carry(cloth_collide *c, const clothi_obstacle *o, int at_once) {
    int i, j;
    for (i = 0; i < c->sim->model->desc.max_attachments; i++) {
        cloth_step_attachment *q = c->sim->attach + i;
        if (q->on != (int)(o - c->obstacle) + 1) continue;
        memset(q->target, 0, sizeof q->target);
        if (q->other >= o->nf) (void)cloth_sim_detach(c->sim, clothi_attachment_id(c->sim, i));
        for (j = 0; q->used && j < 9; j++)
            q->target[j % 3] += q->at[j / 3] *
                                clothi_pose(o, 1)[3 * o->faces[3 * q->other + j / 3] + j % 3];
        if (at_once) memcpy(q->pose, q->target, sizeof q->pose);
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_remove(cloth_collide *c, cloth_obstacle id) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_remove");
    cloth_status     status;
    if (!o) return CLOTH_ERR_HANDLE;
    status = clothi_world_change(c, o);
    if (status) return status;
    clothi_obstacle_free(c->hooks, o);
    clothi_obstacle_forget(c, (int)(o - c->obstacle));
    return clothi_carry(c, o, 0);
}

CLOTH_API cloth_status cloth_collide_attach(cloth_collide *c, cloth_obstacle id, int obstacle_face,
                                            const double at[3], int face, const double bary[3],
                                            double k, cloth_attachment *attachment) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_attach");
    cloth_status     status;
    if (attachment) attachment->id = 0;
    if (!o) return CLOTH_ERR_HANDLE;
    if (obstacle_face < 0 || obstacle_face >= o->nf)
        return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "cloth_collide_attach: obstacle_face %i "
                           "but obstacle %i has %i", obstacle_face, (int)(uint32_t)id.id, o->nf);
    status = clothi_attach_add(c->sim, face, bary, k, (int)(o - c->obstacle) + 1, obstacle_face,
                               at, attachment);
    return status ? status : clothi_carry(c, o, 0);
}

/* x: where vertices of o (NULL: none there) are to be. */
static cloth_status clothi_pose_check(const cloth_collide *c, const clothi_obstacle *o,
                                      const char *call, const double *x) {
    if (!o) return CLOTH_ERR_HANDLE;
    if (!x) return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "%s: x is NULL", call);
    return clothi_check_places(c->hooks, call, ": x", x, o->nv,
                               clothi_farthest_place(o->thickness));
}

CLOTH_API cloth_status cloth_collide_move(cloth_collide *c, cloth_obstacle id,
                                          const double *x_end) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_move");
    cloth_status     status = clothi_pose_check(c, o, "cloth_collide_move", x_end);
    if (status) return status;
    memcpy(clothi_pose(o, 1), x_end, 3 * (size_t)o->nv * sizeof(double));
    memcpy(o->turn[1], o->turn[0], sizeof o->turn[0]);  /* of a pose that this replaces */
    return clothi_carry(c, o, 0);
}

#define CLOTHI_ROTATION 1e-6                /* of R' R from 1                                  */

CLOTH_API cloth_status cloth_collide_pose(cloth_collide *c, cloth_obstacle id, const double R[9],
                                          const double p[3]) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_pose");
    double           none[2][9], off = 0, turns = 0, up[3];
    const double    *turn = R ? R : none[0];
    cloth_status     status;
    int              i, j, k;
    clothi_no_turn(none);
    if (!o) return CLOTH_ERR_HANDLE;
    if (!p) return clothi_null(c->hooks, "cloth_collide_pose: p");
    status = clothi_check_places(c->hooks, "cloth_collide_pose", ": R", turn, 3, CLOTHI_FARTHEST);
    if (!status) status = clothi_check_places(c->hooks, "cloth_collide_pose", ": p", p, 1,
                                              clothi_farthest_place(o->thickness));
    if (status) return status;
    for (i = 0; i < 9; i++) {
        turns = clothi_max(turns, fabs(turn[i] - none[0][i]));
        off = clothi_max(off, fabs(turn[i / 3] * turn[i % 3] + turn[3 + i / 3] * turn[3 + i % 3] +
                                   turn[6 + i / 3] * turn[6 + i % 3] - (i % 4 == 0)));
    }
    clothi_cross3(turn + 3, turn + 6, up);
    if (off > CLOTHI_ROTATION || clothi_dot3(turn, up) < 0)
        return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_collide_pose: R is no rotation, R' R is %g off 1", off);
    if (clothi_is_wall(o) && turns > 0)
        return clothi_fail(c->hooks, CLOTH_ERR_UNSUPPORTED,
                           "cloth_collide_pose: R turns obstacle %i, a plane or a grid",
                           (int)(uint32_t)id.id);
    for (i = 0; i < o->nv; i++)
        for (k = 0; k < 3; k++) {
            const double *x = clothi_pose(o, 2) + 3 * i;
            double        to = p[k];
            for (j = 0; j < 3; j++) to += turn[3 * k + j] * x[j];
            clothi_pose(o, 1)[3 * i + k] = to;
        }
    memcpy(o->turn[1], turns > 0 ? turn : none[0], sizeof o->turn[1]);  /* no -0.0 */
    return clothi_carry(c, o, 0);
}

CLOTH_API cloth_status cloth_collide_set_friction(cloth_collide *c, cloth_obstacle id,
                                                  double friction) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_set_friction");
    cloth_status     status;
    if (!o) return CLOTH_ERR_HANDLE;
    status = clothi_check_range(c->hooks, "cloth_collide_set_friction: ", "friction", friction, 0,
                                CLOTHI_ROUGHEST, 0);
    if (!status) clothi_set(c->sim, &o->friction, &friction, sizeof friction);
    return status;
}

CLOTH_API cloth_status cloth_collide_set_surface(cloth_collide *c, cloth_obstacle id,
                                                 const double v[3], const double omega[3]) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_set_surface");
    double           surface[6] = {0, 0, 0, 0, 0, 0};
    cloth_status     status = o ? CLOTH_OK : CLOTH_ERR_HANDLE;
    int              i;
    if (v) memcpy(surface, v, 3 * sizeof *v);
    if (omega) memcpy(surface + 3, omega, 3 * sizeof *omega);
    for (i = 0; i < 2 && !status; i++)
        status = clothi_check_places(c->hooks, "cloth_collide_set_surface",
                                     i ? ": omega" : ": v", surface + 3 * i, 1, CLOTHI_FARTHEST);
    if (!status) clothi_set(c->sim, o->surface, surface, sizeof surface);
    return status;
}

CLOTH_API cloth_status cloth_collide_teleport(cloth_collide *c, cloth_obstacle id,
                                              const double *x) {
    clothi_obstacle *o = clothi_obstacle_of(c, id, "cloth_collide_teleport");
    cloth_status     status = clothi_pose_check(c, o, "cloth_collide_teleport", x);
    void            *spare;
    size_t           bytes;
    if (status) return status;
    bytes = 3 * (size_t)o->nv * sizeof(double);
    spare = clothi_copy(c->hooks, o->x, 2, bytes);
    if (!spare) return CLOTH_ERR_MEMORY;
    memcpy(clothi_pose(o, 0), x, bytes);
    memcpy(clothi_pose(o, 1), x, bytes);
    status = clothi_name_pairs(c, c->exempt, c->nexempt);
    if (!status) status = clothi_collide_look(c);
    if (status) memcpy(o->x, spare, 2 * bytes);
    if (status && status != CLOTH_ERR_MESH) c->nfailed = 0;
    clothi_free(c->hooks, spare);
    if (status) return status;
    memcpy(o->turn[1], o->turn[0], sizeof o->turn[0]);
    c->sim->still = 0;
    clothi_obstacle_forget(c, (int)(o - c->obstacle));
    clothi_tape_break(c->sim);
    return clothi_carry(c, o, 1);
}

/* --- a step that may be shorter --- */

/* Failed in a way that a shorter step may not. */
static int clothi_shortens(const cloth_report *r) {
    return r->outcome == CLOTH_STEP_COLLISION_FAILED || r->outcome == CLOTH_STEP_STALLED;
}

CLOTH_API cloth_status cloth_collide_step(cloth_collide *c, double h, int halvings,
                                          cloth_report *report) {
    cloth_report local, *r = report ? report : &local;
    cloth_status status;
    double       part = 1;
    int          k;
    if (!c) return clothi_refused(report, CLOTH_ERR_ARGUMENT);
    if (halvings < 0 || halvings > 30)
        return clothi_refused(report, clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT,
                              "cloth_collide_step: halvings = %i is not in 0 .. 30", halvings));
    c->report.fraction = 0;
    status = cloth_step(c->sim, h, r);
    for (k = 0; k < halvings && clothi_shortens(r); k++) {
        c->sim->fraction = part *= 0.5;
        status = cloth_step(c->sim, h * part, r);
    }
    c->sim->fraction = 1;
    return status;
}

/* ===== [8.6] QUERIES ========================================================================= */

CLOTH_API cloth_collide_report cloth_collide_last(const cloth_collide *c) {
    cloth_collide_report none;
    memset(&none, 0, sizeof none);
    return c ? c->report : none;
}

/* An output with room for `max` entries, which is given or not. */
static cloth_status clothi_query_check(const cloth_collide *c, const char *call, int max,
                                       int given) {
    if (!c) return CLOTH_ERR_ARGUMENT;
    if (max < 0) return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "%s: max = %i", call, max);
    if (max == 0 || given) return CLOTH_OK;
    return clothi_fail(c->hooks, CLOTH_ERR_ARGUMENT, "%s: its output is NULL", call);
}

/* Contact i of all: those of the potential, then the active rows of zones. */
static clothi_contact clothi_contact_at(const cloth_collide *c, int i) {
    clothi_contact q;
    if (i < c->ncontact) return c->contact[i];
    q = clothi_row_contact(c, c->row + (i - c->ncontact));
    q.force = c->row[i - c->ncontact].impulse / c->h;
    return q;
}

static void clothi_contact_out(const cloth_collide *c, int i, cloth_collide_contact *out) {
    const clothi_contact q = clothi_contact_at(c, i);
    const clothi_pair_id id = {q.kind, q.a, q.b};
    double               sum[2] = {0, 0};
    int                  j, k;
    memset(out, 0, sizeof *out);
    out->pair = clothi_public_pair(c, &id);
    memcpy(out->normal, q.normal, sizeof out->normal);
    for (j = 0; j < q.n; j++) {
        const int side = q.w[j] < 0;
        sum[side] += q.w[j];
        for (k = 0; k < 3; k++) out->point[side][k] += q.w[j] * c->x_last[3 * q.v[j] + k];
        if (q.v[j] >= c->nv) continue;
        out->vertex[out->n] = q.v[j];
        out->weight[out->n++] = q.w[j];
    }
    for (j = 0; j < 2; j++)
        for (k = 0; k < 3 && fabs(sum[j]) > 0; k++) out->point[j][k] /= sum[j];
    for (k = 0; k < 3; k++) out->gap += (out->point[0][k] - out->point[1][k]) * q.normal[k];
    for (k = 0; k < 3 && q.kind == CLOTHI_VP; k++)      /* the foot of the vertex */
        out->point[1][k] = out->point[0][k] - out->gap * q.normal[k];
    j = !out->pair.reversed;                /* the obstacle's side */
    for (k = 0; k < 3; k++) out->point[j][k] += (j ? q.radius : -q.radius) * q.normal[k];
    out->gap = i < c->ncontact ? q.gap : out->gap - q.radius;
    out->force = q.force;
    out->limit = q.limit;
    for (k = 0; k < 3; k++) out->friction[k] = -q.tangent[k];
    for (k = 0; k < out->n; k++)
        if (c->report.held && c->held_of[out->vertex[k]] >= 0)
            out->flags |= CLOTH_CONTACT_HELD;
    if (i >= c->ncontact) out->flags |= CLOTH_CONTACT_ROW;
    else if (c->inexact) out->flags |= CLOTH_CONTACT_INEXACT;
    if (q.size > c->desc.slip) out->flags |= CLOTH_CONTACT_SLIDING;
}

CLOTH_API cloth_status cloth_collide_contacts(const cloth_collide *c, int max,
                                              cloth_collide_contact *contact, int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_contacts", max, contact != NULL);
    int          i, n = 0;
    if (status) return status;
    for (i = 0; i < c->ncontact + c->nrow; i++)
        if (clothi_contact_at(c, i).force > 0 && n++ < max)
            clothi_contact_out(c, i, contact + n - 1);
    if (count) *count = n;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_wrench(const cloth_collide *c, cloth_obstacle id,
                                            const double about[3], double force[3],
                                            double torque[3]) {
    cloth_collide_contact q;
    cloth_status status = CLOTH_OK;
    int          i, k;
    if (!clothi_obstacle_of(c, id, "cloth_collide_wrench")) return CLOTH_ERR_HANDLE;
    status = clothi_query_check(c, "cloth_collide_wrench", 1, force && torque);
    if (!status && about)
        status = clothi_check_vector(c->hooks, "cloth_collide_wrench: about", about, 3);
    if (status) return status;
    for (k = 0; k < 3; k++) force[k] = torque[k] = 0;
    for (i = 0; i < c->ncontact + c->nrow; i++) {
        double f[3], r[3], t[3], side;
        clothi_contact_out(c, i, &q);
        if (q.pair.obstacle.id != id.id || !(q.force > 0)) continue;
        side = q.pair.reversed ? 1 : -1;
        for (k = 0; k < 3; k++) {
            f[k] = side * (q.force * q.normal[k] + q.friction[k]);
            r[k] = q.point[side < 0][k] - (about ? about[k] : 0);
        }
        clothi_cross3(r, f, t);
        for (k = 0; k < 3; k++) force[k] += f[k], torque[k] += t[k];
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_holds(const cloth_collide *c, int max, cloth_hold *hold,
                                           int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_holds", max, hold != NULL);
    int          i;
    for (i = 0; !status && i < max && i < c->nhold; i++) hold[i] = c->hold[i];
    if (!status && count) *count = c->nhold;
    return status;
}

/* Forces on the cloth's vertices: all, or friction alone. */
static cloth_status clothi_contact_forces(const cloth_collide *c, const char *call, int all,
                                          double *f) {
    cloth_status status = clothi_query_check(c, call, 1, f != NULL);
    int          i, j, k;
    if (status) return status;
    memset(f, 0, 3 * (size_t)c->nv * sizeof(double));
    for (i = 0; i < c->ncontact + c->nrow; i++) {
        const clothi_contact q = clothi_contact_at(c, i);
        for (j = q.first; j < q.end; j++)
            for (k = 0; k < 3; k++)
                f[3 * q.v[j] + k] += q.w[j] * ((all ? q.force * q.normal[k] : 0) - q.tangent[k]);
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_friction(const cloth_collide *c, double *f) {
    return clothi_contact_forces(c, "cloth_collide_friction", 0, f);
}

CLOTH_API cloth_status cloth_collide_forces(const cloth_collide *c, double *f) {
    return clothi_contact_forces(c, "cloth_collide_forces", 1, f);
}

CLOTH_API cloth_status cloth_collide_gap(cloth_collide *c, double range, double *gap) {
    cloth_status status = clothi_query_check(c, "cloth_collide_gap", 1, gap != NULL);
    int          i;
    if (!status)
        status = clothi_check_range(c->hooks, "cloth_collide_gap: ", "range", range, 0, HUGE_VAL,
                                    CLOTHI_OVER);
    if (!status) status = clothi_look_check(c);
    if (status) return status;
    *gap = range;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    status = clothi_broad_phase(c, c->xb, NULL, CLOTHI_ENDED, range, 0);
    for (i = 0; i < c->npair && !status; i++)
        *gap = clothi_min(*gap, clothi_pair_gap(c, c->xb, &c->pair[i].id));
    return status;
}

CLOTH_API cloth_status cloth_collide_intersections(cloth_collide *c, int max, int *pairs,
                                                   int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_intersections", max, pairs != NULL);
    int          i, n = 0;
    if (!status) status = clothi_look_check(c);
    if (status) return status;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    status = clothi_crossings(c);
    for (i = 0; i < c->nnow && !status; i++) {
        if (c->now[i].kind >= 0 || !clothi_faces_intersect(c->xb, c->faces + 3 * c->now[i].a,
                                                           c->faces + 3 * c->now[i].b))
            continue;
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
    for (i = 0; !status && i < max && i < c->nexempt; i++)
        pair[i] = clothi_public_pair(c, c->exempt + i);
    if (!status && count) *count = c->nexempt;
    return status;
}

CLOTH_API cloth_status cloth_collide_failed(const cloth_collide *c, int max,
                                            cloth_collide_pair *pair, int *count) {
    cloth_status status = clothi_query_check(c, "cloth_collide_failed", max, pair != NULL);
    int          i;
    for (i = 0; !status && i < max && i < c->nfailed; i++) pair[i] = c->failed[i];
    if (!status && count) *count = c->nfailed;
    return status;
}

/* ===== [8.7] UNTANGLING ======================================================================
 *
 *          o   o                    Everything is judged by the cuts: points c where an edge p q of
 *     ____/_\_/_\____  face g       one surface passes a face g of another, or of itself. The line
 *        /   c   \                  of intersection goes from cut to cut, in the faces. It shrinks:
 *       p --- p --- p                 L   its length [VM06]
 *     a corner that poked             A   what it cuts off: of an edge that enters a closed
 *     through: p are wrong                obstacle the part inside, else the smaller area [BWK03]
 *
 *   symbols   e unit along the edge, s = |c - p|/|q - p|, n the normal of g, b barycentric
 *             coordinates of c in g, r unit from c along the line, a = r.e/(e.n)
 *   L         dL = -r.dc,    dc = (1 - e n'/(e.n)) ((1 - s) dp + s dq) + e n'/(e.n) sum b_k dg_k
 *             G = r - a n for the edge, shared as 1 - s to s, and a n for g, shared as b
 *   A         r = e to the wrong end; what only moves along the edge is no gain: G = -a n, and a n
 *   ways out  a vertex where the winding number of a closed obstacle is 1 or more [7.1] goes to the
 *             nearest point of its surface and t/2 on; spheres, capsules, planes likewise
 *   apart     what touches and crosses nothing: 0.4 t along the axis that parts two faces best
 *
 * A vertex goes its way out, else max_move along G (less where |G| is under 0.1), or an edge: G is
 * of the cuts where they are. The motion goes through detection and zones [8.4], which let through
 * features of faces that cross, that are beside such, or that have a vertex inside: no pair of
 * others is new at the end. The measure
 *     sum over vertices inside of area (depth + t)  +  edge^2/4 (L + A),   A in m of edges,
 * has to fall by a thousandth, else half of the motion is tried, .. 1/32: there is no going in
 * circles. Dropped: the material; the way out of a region as a whole (a wall thinner than twice the
 * depth may have cloth on both sides); paths of what is let through.
 *
 * [BWK03] Baraff, Witkin, Kass: Untangling Cloth, SIGGRAPH 2003.
 * [VM06]  Volino, Magnenat-Thalmann: Resolving Surface Collisions through Intersection Contour
 *         Minimization, SIGGRAPH 2006.
 * checked: tests/test_untangle.c */

#define CLOTHI_UNTANGLE_MOVE   5.0          /* t, max_move 0                                   */
#define CLOTHI_UNTANGLE_FALL   1e-3         /* of the measure, in a call                       */
#define CLOTHI_APART           0.4          /* t, what touches; two layers of cloth get twice it */
#define CLOTHI_UNTANGLE_TRIES  6

typedef struct clothi_crossing {            /* edge through face                               */
    int    edge, face;
    int    end;                             /* 0, 1: the wrong end; -1: neither; 2: has a way  */
    double s, b[3], at[3], r[3];            /* as above; at: c, m; r 0: not known              */
    double n[3], e[3];                      /* unit normal of the face; the edge, m            */
} clothi_crossing;

typedef struct clothi_contour {
    clothi_crossing *cut;                   /* [n]                                             */
    int              n;
    double           length;                /* m                                               */
} clothi_contour;

struct clothi_tangle {
    clothi_pair_id *pair;                   /* that intersect or touch, sorted                 */
    int             npair;
    clothi_contour  line;
    double         *d, *g;                  /* [nw x 3] m, ways out, then the motion; G        */
    double         *size;                   /* [nw] m of edges, by root of the area; < 0: wrong */
    double         *span;                   /* [me x 2] of an edge: before, behind its cuts    */
    int            *area, *in;              /* [nw] root; slot + 1 of what it is inside of, 0  */
    unsigned char  *drives, *mask;          /* [nw] 1: d is given, 2: touches; [mf] closed faces */
    double          measure;                /* m^3                                             */
};

/* --- the line of intersection: nothing here knows of a call or a step --- */

/* The edge k of face f through face g at c->xa: 1 and the cut, when it crosses. */
static int clothi_contour_cut(const cloth_collide *c, int f, int k, int g, clothi_crossing *cut) {
    const int     edge = c->features.face_edges[3 * f + k];
    const int    *v = c->faces + 3 * g, *ends = c->edges + 2 * edge;
    const double *p = c->xa + 3 * ends[0], *q = c->xa + 3 * ends[1], *a = c->xa + 3 * v[0];
    double        d[3], high;
    if (clothi_face_has(v, ends[0]) || clothi_face_has(v, ends[1]) ||
        !clothi_surface_pierced(p, q, a, c->xa + 3 * v[1], c->xa + 3 * v[2]))
        return 0;
    memset(cut, 0, sizeof *cut);
    clothi_face_normal(c->xa, v, cut->n);
    clothi_sub3(a, p, d);
    clothi_sub3(q, p, cut->e);
    high = clothi_dot3(cut->n, cut->e);
    cut->edge = edge, cut->face = g, cut->end = -1;
    cut->s = fabs(high) > 0 ? clothi_max(0, clothi_min(1, clothi_dot3(cut->n, d) / high)) : 0.5;
    for (k = 0; k < 3; k++) cut->at[k] = p[k] + cut->s * cut->e[k];
    (void)clothi_face_distance2(c->xa, c->faces + 3 * g, cut->at, cut->b);
    return 1;
}

/* Adds the cuts of two faces at c->xa, six at most: the two farthest from each other end their
 * line. */
static void clothi_contour_find(const cloth_collide *c, const clothi_pair_id *pair,
                                clothi_contour *line) {
    const int first = line->n, face[2] = {pair->a, pair->b};
    double    length = 0;
    int       j, k, ends[2] = {0, 0};
    for (k = 0; k < 6; k++) {
        clothi_crossing *cut = line->cut + line->n;
        if (!clothi_contour_cut(c, face[k / 3], k % 3, face[1 - k / 3], cut)) continue;
        for (j = first; j < line->n; j++) {
            const double apart = sqrt(clothi_apart2(cut->at, line->cut[j].at, 1));
            if (!(apart > length)) continue;
            length = apart;
            ends[0] = j, ends[1] = line->n;
        }
        line->n++;
    }
    line->length += length;
    for (k = 0; k < 6 && length > 0; k++)
        line->cut[ends[k / 3]].r[k % 3] = (line->cut[ends[1 - k / 3]].at[k % 3] -
                                           line->cut[ends[k / 3]].at[k % 3]) / length;
}

/* g [nw x 3] += G of the cuts, but of those that have another way. */
static void clothi_contour_shrink(const cloth_collide *c, const clothi_contour *line, double *g) {
    int i, k, j;
    for (i = 0; i < line->n; i++) {
        const clothi_crossing *cut = line->cut + i;
        const int *v = c->edges + 2 * cut->edge, *f = c->faces + 3 * cut->face;
        double     slope, size, a;
        if (cut->end > 1) continue;
        size = sqrt(clothi_dot3(cut->e, cut->e));
        slope = clothi_dot3(cut->e, cut->n) / size;
        slope = fabs(slope) > 0.05 ? slope : slope < 0 ? -0.05 : 0.05;
        a = cut->end < 0 ? clothi_dot3(cut->r, cut->e) / size : cut->end ? 1 : -1;
        for (k = 0; k < 3 && size > 0; k++) {
            const double across = a / slope * cut->n[k], along = cut->end < 0 ? cut->r[k] : 0;
            for (j = 0; j < 2; j++)
                g[3 * v[j] + k] += (j ? cut->s : 1 - cut->s) * (along - across);
            for (j = 0; j < 3; j++) g[3 * f[j] + k] += cut->b[j] * across;
        }
    }
}

/* --- ways out --- */

/* The ways of vertices out of obstacle `slot`, and cuts by its closed faces: their inner end is
 * wrong, and has a way when it is a vertex inside. */
static cloth_status clothi_tangle_inside(const cloth_collide *c, clothi_tangle *u, int slot) {
    const clothi_obstacle *o = c->obstacle + slot;
    const clothi_surface   solid = {c->xa, c->faces, u->mask, NULL, &c->solid};
    clothi_surface_defects defects;
    cloth_status           status;
    int                    i, k;
    memset(u->mask, 0, (size_t)c->mf);
    status = clothi_surface_check(c->hooks, o->nv, o->nf, o->x, o->faces, u->mask + o->f0,
                                  &defects);
    if (o->kind == CLOTH_OBSTACLE_MESH && defects.volume < 0) memset(u->mask, 0, (size_t)c->mf);
    for (i = 0; i < c->nv && !status; i++) {
        const double *p = c->xa + 3 * i;
        double        n[3], b[3], d2 = CLOTHI_HUGE;
        int           f, wind;
        if (!clothi_may_touch(c, i, o->v0)) continue;
        wind = clothi_surface_winding(&solid, p);
        if (!(o->kind == CLOTH_OBSTACLE_BOX ? wind : wind >= 1)) continue;
        f = clothi_surface_nearest(&solid, p, &d2, b);
        if (f < 0) continue;                /* its square overflows */
        clothi_face_normal(c->xa, c->faces + 3 * f, n);
        for (k = 0; k < 3; k++) {
            const double *x = c->xa + k;
            const int    *q = c->faces + 3 * f;
            u->d[3 * i + k] += b[0] * x[3 * q[0]] + b[1] * x[3 * q[1]] + b[2] * x[3 * q[2]] - p[k] +
                               CLOTHI_GAP * c->desc.thickness * n[k];
        }
        u->drives[i] = 1;
        u->measure += c->area[i] * (sqrt(d2) + c->desc.thickness);
        u->in[i] = slot + 1;
    }
    for (i = 0; i < u->line.n && !status; i++) {
        clothi_crossing *cut = u->line.cut + i;
        const int       *v = c->edges + 2 * cut->edge;
        if (!u->mask[cut->face]) continue;
        cut->end = clothi_dot3(cut->n, cut->e) < 0;
        if (u->in[v[0]] == slot + 1 || u->in[v[1]] == slot + 1) cut->end = 2;
    }
    return status;
}

/* 1 when an axis parts faces f < g at c->xa but for t/50 000: G takes their corners apart along it.
 * Where none does better cloth goes out of an obstacle, of two cloths the first one back. */
static int clothi_tangle_skin(const cloth_collide *c, clothi_tangle *u, const int *f,
                              const int *g) {
    const double t = c->desc.thickness, *x = c->xa;
    const int    solid = c->slot[g[0]] >= 0;
    double       first[3], way[3] = {0, 0, 0}, best = -CLOTHI_SKIN * t, a[3], d[6];
    int          i, k;
    clothi_face_cross(x, solid ? g : f, first);
    for (i = 0; i < 22; i++) {              /* along, then against: normals, edge x edge */
        const int j = i % 11;
        double    to, low = HUGE_VAL, high = -HUGE_VAL;
        clothi_sub3(x + 3 * f[(j + 1) / 3 % 3], x + 3 * f[(j + 4) / 3 % 3], d);
        clothi_sub3(x + 3 * g[(j + 1) % 3], x + 3 * g[(j + 2) % 3], d + 3);
        if (j < 2) clothi_face_cross(x, j == solid ? f : g, a);
        else clothi_cross3(d, d + 3, a);
        to = ((clothi_dot3(a, first) < 0) == ((i < 11) == solid) ? -1 : 1) /
             sqrt(clothi_dot3(a, a));
        for (k = 0; k < 3; k++) {
            low = clothi_min(low, to * clothi_dot3(a, x + 3 * f[k]));
            high = clothi_max(high, to * clothi_dot3(a, x + 3 * g[k]));
        }
        if (!(low - high > best)) continue;
        best = low - high + 1e-3 * CLOTHI_SKIN * t;
        for (k = 0; k < 3; k++) way[k] = to * a[k];
    }
    if (!(best > -CLOTHI_SKIN * t)) return 0;
    for (i = 0; i < 9; i++) {
        u->g[3 * f[i / 3] + i % 3] += way[i % 3];
        u->g[3 * g[i / 3] + i % 3] -= way[i % 3];
        u->drives[f[i / 3]] = u->drives[g[i / 3]] = 2;
    }
    u->measure += c->sim->edge * c->sim->edge * t;
    return 1;
}

/* Edges that are not cut, or by what is closed, join vertices to areas; across a cut the smaller is
 * wrong. A part of an edge before its first cut, or behind its last, counts to its end. */
static void clothi_tangle_areas(const cloth_collide *c, clothi_tangle *u) {
    int i;
    for (i = 0; i < c->nw; i++) u->area[i] = i;
    for (i = 0; i < 2 * c->me; i++) u->span[i] = 1;
    for (i = 0; i < u->line.n; i++) {
        const clothi_crossing *cut = u->line.cut + i;
        double                *e = u->span + 2 * cut->edge;
        if (cut->end >= 0) continue;
        e[0] = clothi_min(e[0], cut->s), e[1] = clothi_min(e[1], 1 - cut->s);
    }
    for (i = 0; i < c->features.ne; i++) {
        const int    *v = c->edges + 2 * i;
        const int     a = clothi_find_root(u->area, v[0]), b = clothi_find_root(u->area, v[1]);
        const double  length = sqrt(clothi_apart2(c->xa + 3 * v[0], c->xa + 3 * v[1], 1));
        const double *part = u->span + 2 * i;
        double        sum;
        u->size[a] += length * part[0];
        u->size[b] += length * part[1];
        if (part[0] + part[1] < 2 || !clothi_join(u->area, a, b)) continue;
        sum = u->size[a] + u->size[b];
        u->size[a] = u->size[b] = 0;
        u->size[clothi_find_root(u->area, a)] = sum;
    }
    for (i = 0; i < u->line.n; i++) {
        clothi_crossing *cut = u->line.cut + i;
        const int       *v = c->edges + 2 * cut->edge;
        const int        p = clothi_find_root(u->area, v[0]), q = clothi_find_root(u->area, v[1]);
        const double     P = fabs(u->size[p]), Q = fabs(u->size[q]);
        if (cut->end >= 0 || p == q) continue;
        cut->end = !(P < Q || (!(Q < P) && p > q));
        u->size[cut->end ? q : p] = cut->end ? -Q : -P;         /* wrong */
    }
    for (i = 0; i < c->nw; i++)
        if (u->size[i] < 0) u->measure -= 0.25 * u->size[i] * c->sim->edge * c->sim->edge;
}

/* The way out of a sphere, a capsule, a plane: n . sum w x grows, shared as by equal masses. */
static void clothi_tangle_lone(const cloth_collide *c, clothi_tangle *u, const clothi_pair_id *p) {
    const double gap = clothi_pair_gap(c, c->xa, p);
    double       x[12], w[4] = {1, -1, 0, 0}, n[3], sum = 0;
    int          v[4], i, count = clothi_pair_vertices(c, p, v);
    clothi_pair_points(c, c->xa, v, count, x);
    if (p->kind == CLOTHI_VP) memcpy(n, c->obstacle[p->b].normal, sizeof n);
    else (void)clothi_contact_frame(p->kind == CLOTHI_EE, x, x, 0, w, n);
    for (i = 0; i < count; i++) sum += v[i] < c->nv ? w[i] * w[i] : 0;
    for (i = 0; i < 3 * count; i++)
        if (v[i / 3] < c->nv && fabs(w[i / 3]) > 0) {
            u->d[3 * v[i / 3] + i % 3] +=
                w[i / 3] / sum * (CLOTHI_GAP * c->desc.thickness - gap) * n[i % 3];
            u->drives[v[i / 3]] = 1;
        }
    u->measure += c->sim->edge * c->sim->edge * (c->desc.thickness - gap);
}

/* The pairs c->now at xa: cuts, ways out, G, the measure. *u is 0. */
static cloth_status clothi_tangle_look(cloth_collide *c, clothi_tangle *u) {
    const size_t nw = (size_t)c->nw, one = sizeof(int), real = sizeof(double);
    const clothi_array need[] = {
        {&u->d, 3 * nw, real}, {&u->g, 3 * nw, real}, {&u->size, nw, real},
        {&u->span, 2 * (size_t)c->me, real}, {&u->area, nw, one}, {&u->in, nw, one},
        {&u->drives, nw, 1}, {&u->mask, (size_t)c->mf, 1},
        {&u->pair, (size_t)c->nnow, sizeof *u->pair},
        {&u->line.cut, 6 * (size_t)c->nnow, sizeof *u->line.cut}};
    cloth_status status = clothi_arrays(c->hooks, need, sizeof need / sizeof *need);
    int          i, o;
    if (status) return status;
    for (i = 0; i < c->nnow; i++) u->pair[u->npair++] = c->now[i];
    for (i = 0; i < u->npair; i++)
        if (u->pair[i].kind == CLOTHI_FF &&
            !clothi_tangle_skin(c, u, c->faces + 3 * u->pair[i].a, c->faces + 3 * u->pair[i].b))
            clothi_contour_find(c, u->pair + i, &u->line);
    CLOTHI_OBSTACLES(c, o)
        if (c->obstacle[o].nf && !status) status = clothi_tangle_inside(c, u, o);
    if (status) return status;
    for (i = 0; i < 5 * u->line.n; i++) {   /* what crosses something as well goes along G */
        const clothi_crossing *cut = u->line.cut + i / 5;
        const int              k = i % 5 - 2;
        const int v = k < 0 ? c->edges[2 * cut->edge + k + 2] : c->faces[3 * cut->face + k];
        if (u->drives[v] != 1) u->drives[v] = 0, memset(u->g + 3 * v, 0, 3 * sizeof(double));
    }
    clothi_tangle_areas(c, u);
    clothi_contour_shrink(c, &u->line, u->g);
    for (i = 0; i < u->npair; i++)
        if (u->pair[i].kind >= 0) clothi_tangle_lone(c, u, u->pair + i);
    u->measure += 0.25 * u->line.length * c->sim->edge * c->sim->edge;
    return CLOTH_OK;
}

/* --- what may pass --- */

/* Faces with a vertex in common. */
static int clothi_faces_beside(const cloth_collide *c, int f, int g) {
    const int *v = c->faces + 3 * f, *w = c->faces + 3 * g;
    return clothi_face_has(v, w[0]) || clothi_face_has(v, w[1]) || clothi_face_has(v, w[2]);
}

/* 1: faces f < g are among the pairs [n], sorted; 2: beside two of those; else 0. */
static int clothi_faces_known(const cloth_collide *c, const clothi_pair_id *pair, int n, int f,
                              int g) {
    clothi_pair_id p = {CLOTHI_FF, f, g};
    int            i, j, k, there;
    (void)clothi_find(pair, sizeof p, n, &p, 3, &there);
    if (there) return 1;
    for (i = 0; i < 6; i++) {               /* around f, then around g */
        const int v = c->faces[3 * (i < 3 ? f : g) + i % 3];
        for (j = c->star[v]; j < c->star[v + 1]; j++) {
            p.a = c->star_face[j];
            k = clothi_find(pair, sizeof p, n, &p, 2, &there);
            for (; k < n && pair[k].kind == CLOTHI_FF && pair[k].a == p.a; k++)
                if (clothi_faces_beside(c, i < 3 ? g : f, pair[k].b)) return 2;
        }
    }
    return 0;
}

/* 1: faces f and g intersected; 2: beside two that did, or a vertex of f was inside; else 0. */
static int clothi_tangle_knew(const cloth_collide *c, int f, int g) {
    const clothi_tangle *u = c->tangle;
    int                  i, known;
    if (f > g) return clothi_tangle_knew(c, g, f);
    known = clothi_faces_known(c, u->pair, u->npair, f, g);
    for (i = 0; i < 3 && !known; i++)
        if (g >= c->nf && u->in[c->faces[3 * f + i]] == c->slot[c->faces[3 * g]] + 1) known = 2;
    return known;
}

/* Pairs that detection lets through while a tangle is moved: all their faces are such. */
static int clothi_tangle_passes(const cloth_collide *c, const clothi_pair_id *p) {
    const int *f, *g;
    int        i, n, m;
    if (p->kind == CLOTHI_VP) return 0;
    f = clothi_pair_faces(c, p, 0, &n), g = clothi_pair_faces(c, p, 1, &m);
    if (n == 0 || f[0] < 0 || g[0] < 0) return 0;
    for (i = 0; i < n * m; i++)
        if (f[i / m] >= 0 && g[i % m] >= 0 && !clothi_tangle_knew(c, f[i / m], g[i % m])) return 0;
    return 1;
}

/* --- a call --- */

/* One try at `part` of the motion. *good: c->x_ie may be taken, and c->now are its pairs. */
static cloth_status clothi_tangle_try(cloth_collide *c, clothi_tangle *u, double part,
                                      cloth_untangle_report *r, int *good) {
    clothi_tangle w;
    cloth_status  status;
    int           i;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    for (i = 0; i < 3 * c->nv; i++) c->x_ie[i] = c->xa[i] + part * u->d[i];
    memcpy(c->now, u->pair, (size_t)u->npair * sizeof *c->now);
    c->nnow = u->npair;
    status = clothi_feasible_from(c, 1);
    if (status) return status == CLOTH_ERR_STEP ? CLOTH_OK : status;
    if (clothi_find_nonfinite(c->xb, 3 * (size_t)c->nv) >= 0) return CLOTH_OK;
    memcpy(c->x_ie, c->xb, 3 * (size_t)c->nv * sizeof(double));
    r->moved = sqrt(clothi_apart2(c->xb, c->xa, c->nv));
    status = clothi_crossings(c);
    for (r->wandered = 0, i = 0; i < c->nnow && !status; i++) {
        const int ff = c->now[i].kind == CLOTHI_FF;
        const int *f = c->faces + 3 * ff * c->now[i].a, *g = c->faces + 3 * ff * c->now[i].b;
        r->wandered += ff && clothi_faces_intersect(c->xb, f, g) &&
                       !clothi_faces_intersect(c->xa, f, g);
    }
    clothi_world_pose(c, c->x_ie, 0, 0);
    memset(&w, 0, sizeof w);
    if (!status) status = clothi_tangle_look(c, &w);
    *good = !status && w.measure <= (1 - CLOTHI_UNTANGLE_FALL) * u->measure;
    clothi_free(c->hooks, w.d);
    return status;
}

/* Tries, and what one of them found becomes state. Where under REFUSE a pair was neither exempt, as
 * pinches let it in, nor beside such, the next step looks, and refuses what is left. */
static cloth_status clothi_tangle_run(cloth_collide *c, clothi_tangle *u, double most,
                                      cloth_untangle_report *r) {
    const double along = clothi_min(most, c->sim->edge);
    cloth_status status;
    int          good = 0, foreign = 0, i, k;
    clothi_world_pose(c, c->sim->state.x, 0, 0);
    status = clothi_crossings(c);
    for (i = 0; i < c->nnow && c->desc.initial == CLOTH_INITIAL_REFUSE; i++) {
        const clothi_pair_id p = c->now[i];
        foreign |= p.kind != CLOTHI_FF || !clothi_faces_known(c, c->exempt, c->nexempt, p.a, p.b);
    }
    r->before = r->after = c->nnow;
    if (!status && c->nnow) status = clothi_tangle_look(c, u);
    if (status) return status;
    if (c->nnow) {
        for (i = 0; i < c->nv; i++) {       /* the way out, else along G */
            const double *g = u->g + 3 * i, size2 = clothi_dot3(g, g);
            const double  apart = CLOTHI_APART * c->desc.thickness / sqrt(clothi_max(size2, 1));
            const double  pull = u->drives[i] ? apart : along / sqrt(size2 + 0.01);
            double       *d = u->d + 3 * i, size;
            for (k = 0; k < 3 && u->drives[i] != 1; k++) d[k] = pull * g[k];
            size = sqrt(clothi_dot3(d, d));
            for (k = 0; k < 3; k++)
                d[k] *= c->sim->pin[i] >> k & 1 ? 0 : size > most ? most / size : 1;
        }
        c->tangle = u;
        while (r->tries < CLOTHI_UNTANGLE_TRIES && !good && !status)
            status = clothi_tangle_try(c, u, ldexp(1, -r->tries++), r, &good);
        c->tangle = NULL;
        c->nrow = c->ncontact = 0;
        r->stalled = !status && !good;
        if (!good) return status;
        memcpy(c->sim->state.x, c->x_ie, 3 * (size_t)c->nv * sizeof(double));
        cloth_sim_state_changed(c->sim);
    }
    r->after = c->nnow;
    clothi_look_accept(c);
    if (foreign && c->nexempt) c->nexempt = 0, c->seen = 0;
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_collide_untangle(cloth_collide *c, double max_move,
                                              cloth_untangle_report *report) {
    cloth_untangle_report local, *r = report ? report : &local;
    cloth_collide_report  kept;
    clothi_tangle         u;
    const cloth_hooks    *hooks;
    cloth_hooks           quiet;
    cloth_status          status;
    memset(r, 0, sizeof *r);
    memset(&u, 0, sizeof u);
    if (!c) return CLOTH_ERR_ARGUMENT;
    status = clothi_check_range(c->hooks, "cloth_collide_untangle: ", "max_move", max_move, 0,
                                HUGE_VAL, 0);
    if (!status) status = clothi_look_check(c);
    if (status) return status;
    if (!(max_move > 0)) max_move = CLOTHI_UNTANGLE_MOVE * c->desc.thickness;
    kept = c->report;
    hooks = c->hooks;
    quiet = *hooks;                         /* tries that fail are not the answer */
    quiet.log.fn = NULL;
    c->hooks = &quiet;
    c->nfailed = c->nholding = 0;
    c->h = 1, c->approach = CLOTHI_APPROACH;
    status = clothi_tangle_run(c, &u, max_move, r);
    c->hooks = hooks;
    c->report = kept;
    c->report.exempt_pairs = c->nexempt, c->report.held = c->nhold;
    if (r->stalled) {
        status = clothi_fail_pairs(c, u.pair, u.npair,
                                   "intersect, and no motion that was tried makes them less",
                                   ". Pinned vertices are not moved");
        if (c->nfailed) r->pair = c->failed[0];
    }
    clothi_free(hooks, u.d);
    return status;
}

CLOTHI_RARE_END

/* ===== [8.8] DERIVATIVES =====================================================================
 *
 *   contacts' part of the gradient at x     F(x; x^n, poses, mu, anchors)
 *   a given: a.F is differentiated backwards, contact by contact
 *
 *     a.F = sum over contacts  Z.(T - f n),     Z = sum w a    f normal force, T friction
 *
 *     T     = mu f b(|u|) u,  u = (1 - n n')(slip + carry + sum w (x - x^n))
 *     f     = (e/E)^7 e' of the group's norm, e(gap, start, share), and the guard
 *     start = gap at x^n, or what the anchor has;  share, of the frame at x^n
 *     slip  = of the key's anchor: the mean of u of the step before, turned with the surface
 *     gap, n, w    of the closest points: d(sum w x) = w dx + r ds,
 *                  ds = -G^-1 (r' w + D' dw/ds) dx,  G = r'r, D = sum w x, r = d(D)/ds
 *
 * Nothing is lagged here: frames and normal forces are those of x, at which Newton's search
 * arrives when it converges. So dF/dx is not symmetric, and a.F may be asked for its part by x
 * alone, as a linear solver does. Then what is left of a goes to all other causes, once a substep;
 * what an anchor got is kept for the contacts of the substep before.
 *
 * LEAPFROG has rows of impact zones instead [8.4]: clothsim_grad.h [4.3] hands back what goes by
 * their normals, weights and bounds, of the pair at its time of impact, which moves too.
 *
 * Constants are: which pairs, keys and exempt pairs there are, areas and ranges (of the template),
 * stiffness. Taken as such though they move, and told (vjp.frozen): normals of distance grids,
 * where in its faces a pinch holds a vertex and their normals, v^n and the edges by which one goes
 * out, zones that went on as one body, rows that were made where a way ends.
 * checked: tests/test_grad_contact.c
 */

typedef struct clothi_rates {                /* adjoint of one contact                          */
    double force, gap, share, start, w[4], n[3];
} clothi_rates;

struct clothi_adjoint {                     /* a walk backwards                                */
    const cloth_hooks *hooks;
    double        *pose[2];                 /* [nw - nv x 3] by the step's end, by its start   */
    double        *world[2];                /* the same by xa and xb of a substep              */
    double        *friction;                /* [1 + nobstacle + nparts]                        */
    clothi_anchor *after, *before;          /* by anchors after the substep, and before it     */
    clothi_anchor *moved, *going;           /* forwards: how these move                        */
    clothi_rates   *back;                    /* of a group                                      */
    int            nafter, nbefore, nmoved, ngoing, after_cap, before_cap, moved_cap, going_cap;
    int            back_cap;
};

typedef struct clothi_flow {                /* one call of vjp                                 */
    cloth_collide  *c;
    clothi_adjoint *to;
    int             whole;                  /* 0: by x alone                                   */
    const double  *a;                       /* [nv x 3]; NULL: by anchors alone                */
    double        *cloth[2];                /* [nv x 3] by x^n, by x; NULL: not wanted         */
} clothi_flow;

/* d/d{world vertex v} at the substep's start (0) or end (1) += s d. */
static void clothi_flow_add(const clothi_flow *f, int end, int v, double s, const double *d) {
    const int nv = f->c->nv;
    double   *to = v < nv ? f->cloth[end] : f->whole ? f->to->world[end] : NULL;
    int       k;
    if (!to) return;
    for (to += 3 * (v < nv ? v : v - nv), k = 0; k < 3; k++) to[k] += s * d[k];
}

/* Gap, normal and weights of points p to these: to [4 x 3]. */
static void clothi_back_points(const clothi_contact *q, const clothi_frame *at, const double *p,
                               const clothi_rates *b, double *to) {
    const double d = at->gap + q->radius, nn = clothi_dot3(b->n, at->normal);
    double rate[8], along[6], D[3], s[2] = {0, 0}, g[3], det, more[3];
    int    m = 0, i, j, k;
    if (q->kind != CLOTHI_VP && d > 0) m = clothi_frame_rates(q, at->w, p, rate, along);
    for (k = 0; k < 3; k++)
        D[k] = (q->kind == CLOTHI_VP ? 0 : (b->n[k] - nn * at->normal[k]) / d) +
               b->gap * at->normal[k];
    for (j = 0; j < m; j++)
        for (s[j] = clothi_dot3(along + 3 * j, D), i = 0; i < q->n; i++)
            s[j] += rate[4 * j + i] * b->w[i];
    g[0] = m ? clothi_dot3(along, along) : 1;
    g[1] = m > 1 ? clothi_dot3(along, along + 3) : 0;
    g[2] = m > 1 ? clothi_dot3(along + 3, along + 3) : 1;
    det = g[0] * g[2] - g[1] * g[1];
    if (m > 1 && !(det > 1e-12 * g[0] * g[2])) m = 1, s[1] = g[1] = 0, g[2] = 1, det = g[0];
    det = det > 0 ? -1 / det : 0;
    more[0] = det * (g[2] * s[0] - g[1] * s[1]);
    s[1] = det * (g[0] * s[1] - g[1] * s[0]);
    s[0] = more[0];
    for (i = 0; i < q->n; i++)
        for (k = 0; k < 3; k++)
            for (to[3 * i + k] = at->w[i] * D[k], j = 0; j < m; j++)
                to[3 * i + k] += s[j] * (rate[4 * j + i] * d * at->normal[k] +
                                         at->w[i] * along[3 * j + k]);
}

/* The same of x^n (end 0) or of x, which is in xb. */
static void clothi_back_frame(const clothi_flow *f, const clothi_contact *q, int end,
                              const clothi_frame *at, const clothi_rates *b) {
    const cloth_collide *c = f->c;
    double p[12] = {0}, to[12];
    int    i;
    clothi_pair_points(c, end ? c->xb : c->xa, q->v, q->n, p);
    clothi_back_points(q, at, p, b, to);
    for (i = 0; i < q->n; i++) clothi_flow_add(f, end, q->v[i], 1, to + 3 * i);
}

/* clothi_falls_off backwards, of vertices v, o and the edge at x^n: rate of what it returns. */
static void clothi_back_falls(const clothi_flow *f, int v, int o, const int *edge, const double *d,
                              double rate, double *to_d) {
    double       r[3], e[3], n[3], along, size;
    const double fall = clothi_fall(f->c, v, o, edge, d, r, e, &along);
    int          k;
    size = sqrt(clothi_dot3(r, r));
    if (!(fall > 0 && fall < 1)) return;
    rate *= 6 * fall * (1 - fall) / (CLOTHI_CONVEX * size);
    for (k = 0; k < 3; k++) {
        to_d[k] -= rate * r[k];
        n[k] = -rate * (d[k] + fall * CLOTHI_CONVEX * r[k] / size);
    }
    if (edge) {
        size = clothi_dot3(n, e) / clothi_dot3(e, e);
        for (k = 0; k < 3; k++) n[k] -= size * e[k], r[k] = -along * n[k] - size * r[k];
        clothi_flow_add(f, 0, edge[1], 1, r);
        clothi_flow_add(f, 0, edge[0], -1, r);
    }
    clothi_flow_add(f, 0, o, 1, n);
    clothi_flow_add(f, 0, v, -1, n);
}

/* clothi_contact_share backwards, to the frame `at` of x^n: share, its rate, into b. */
static void clothi_back_share(const clothi_flow *f, const clothi_contact *q, const clothi_frame *at,
                              double share, clothi_rates *b) {
    const cloth_collide *c = f->c;
    const double s = at->w[1], t = -at->w[3], rate = share * q->share;
    double       p[12], r[6], d[3], to[3] = {0, 0, 0}, ee, rr, er, sine, by;
    int          i, k, o;
    if (q->kind == CLOTHI_VP || at->gap > 2 * q->range || !(fabs(rate) > 0)) return;
    if (q->kind == CLOTHI_VF) {             /* of an obstacle's vertex it is how convex that is */
        if (q->a < c->nv || q->radius > 0) return;
        for (k = 0; k < 3; k++) d[k] = -at->normal[k];
        (void)clothi_vertex_convex(c, q->a, d, &i);
        if (i >= 0) clothi_back_falls(f, q->a, i, NULL, d, share, to);
        for (k = 0; k < 3; k++) b->n[k] -= to[k];
        return;
    }
    if (!(q->radius > 0)) {
        b->w[1] += rate * 2 * (1 - 2 * s) / (s * (1 - s));
        b->w[3] -= rate * 2 * (1 - 2 * t) / (t * (1 - t));
    }
    clothi_pair_points(c, c->xa, q->v, 4, p);
    clothi_sub3(p + 3, p, r);
    clothi_sub3(p + 9, p + 6, r + 3);
    ee = clothi_dot3(r, r), rr = clothi_dot3(r + 3, r + 3), er = clothi_dot3(r, r + 3);
    clothi_cross3(r, r + 3, d);
    sine = clothi_dot3(d, d) / (ee * rr) / CLOTHI_PARALLEL;
    by = -4 * rate * (1 - sine) / (sine * (2 - sine)) / CLOTHI_PARALLEL * er / (ee * rr);
    for (i = 0; i < 2 && sine < 1; i++) {   /* sin^2 = 1 - (e.r)^2/(e.e r.r) */
        for (k = 0; k < 3; k++)
            d[k] = by * (r[3 * (1 - i) + k] - er / (i ? rr : ee) * r[3 * i + k]);
        clothi_flow_add(f, 0, q->v[2 * i + 1], 1, d);
        clothi_flow_add(f, 0, q->v[2 * i], -1, d);
    }
    for (i = 0; i < 2; i++) {               /* how convex an obstacle's edge is, a factor */
        const int     e = i ? q->b : q->a, *v = c->edges + 2 * e;
        const double *n = at->normal;
        if (*v < c->nv) continue;
        for (k = 0; k < 3; k++) d[k] = i ? n[k] : -n[k], to[k] = 0;
        for (k = 0; k < 2; k++)
            if ((o = clothi_edge_across(c, e, k)) >= 0)
                clothi_back_falls(f, *v, o, v, d, rate / clothi_falls_off(c, *v, o, v, d), to);
        for (k = 0; k < 3; k++) b->n[k] += i ? to[k] : -to[k];
    }
}

/* Axes of clothi_contact_axes at x (end 1) or x^n backwards: to [6] by them, n the normal. */
static void clothi_back_axes(const clothi_flow *f, const clothi_contact *q, int end,
                             const double *n, const double *axes, const double *to, double *to_n) {
    const cloth_collide *c = f->c;
    const int *v = q->v + (q->kind == CLOTHI_VF ? 1 : q->slot >= 0 && q->v[0] >= c->nv ? 0 : 2);
    const double *x = end ? c->xb : c->xa;
    double     e[3], g[3], h[3], along, size = 0;
    int        k;
    clothi_sub3(x + 3 * v[1], x + 3 * v[0], e);
    clothi_cross3(to + 3, n, g);            /* the second axis is n x the first */
    clothi_cross3(axes, to + 3, h);
    along = clothi_dot3(e, n);
    for (k = 0; k < 3; k++) g[k] += to[k], to_n[k] += h[k], size += e[k] * axes[k];
    h[0] = clothi_dot3(g, axes);
    for (k = 0; k < 3; k++) g[k] = (g[k] - h[0] * axes[k]) / size;
    h[0] = clothi_dot3(g, n);
    for (k = 0; k < 3; k++) to_n[k] -= h[0] * e[k] + along * g[k];
    for (k = 0; k < 3; k++) g[k] -= h[0] * n[k];
    clothi_flow_add(f, end, v[1], 1, g);
    clothi_flow_add(f, end, v[0], -1, g);
}

/* clothi_contact_turn of slip u backwards: y by what it returns, to u and the surface. */
static void clothi_back_turn(const clothi_flow *f, const clothi_contact *q, const double *u,
                             const double *y, double *to_u, clothi_rates *b) {
    const cloth_collide   *c = f->c;
    const clothi_obstacle *o = q->slot < 0 ? NULL : c->obstacle + q->slot;
    clothi_frame           at;
    clothi_rates            start;
    double a[6], e[6], to[6], from[6], back[3] = {0, 0, 0}, slip[3];
    int    k, i, axes = 0;
    memcpy(slip, u, sizeof slip);
    clothi_surface_turn(c, o, 1, slip);
    memset(&start, 0, sizeof start);
    if (o && !clothi_is_mesh(o)) clothi_turned(o->turned[1], o->turned[0], y, back);
    else {
        clothi_contact_frame_at(c, q, c->xa, &at);
        axes = clothi_contact_axes(c, q, c->xa, at.normal, a) &&
               clothi_contact_axes(c, q, c->xb, q->normal, e);
        if (!axes) memcpy(back, y, sizeof back);
    }
    for (i = 0; i < 6 && axes; i += 3)
        for (k = 0; k < 3; k++) {
            back[k] += clothi_dot3(y, e + i) * a[i + k];
            to[i + k] = clothi_dot3(slip, a + i) * y[k];
            from[i + k] = clothi_dot3(y, e + i) * slip[k];
        }
    clothi_surface_turn(c, o, -1, back);
    for (k = 0; k < 3; k++) to_u[k] += back[k];
    if (!axes) return;
    clothi_back_axes(f, q, 1, q->normal, e, to, b->n);
    clothi_back_axes(f, q, 0, at.normal, a, from, start.n);
    clothi_back_frame(f, q, 0, &at, &start);
}

/* Derivative by the coefficient of a contact to those that made it. */
static void clothi_back_coefficient(const clothi_flow *f, const clothi_contact *q, double rate) {
    double    mu[2];
    int       at[2], i;
    const int n = clothi_pair_friction(f->c, q, at, mu);
    for (i = 0; i < n; i++)
        if (n < 2) f->to->friction[at[i]] += rate;
        else if (mu[i] > 0) f->to->friction[at[i]] += 0.5 * rate * q->friction / mu[i];
}

/* clothi_contact_carry backwards: y by it. */
static void clothi_back_carry(const clothi_flow *f, const clothi_contact *q, const double *y,
                              clothi_rates *b) {
    const cloth_collide   *c = f->c;
    const clothi_obstacle *o = q->slot < 0 ? NULL : c->obstacle + q->slot;
    const int              wall = q->kind == CLOTHI_VP;
    double r[3], g[3], s[3], side = wall ? -1 : 0, part;
    int    i, k;
    if (!o) return;
    for (i = 0; i < q->n && !wall; i++) side += q->v[i] < c->nv ? 0 : q->w[i];
    clothi_cross3(y, o->surface + 3, g);
    clothi_surface_way(c, o, o->swing[!wall], g, s);
    for (k = 0; k < 3; k++) g[k] = side * s[k];
    if (wall) b->start -= clothi_dot3(g, q->normal);
    for (i = 0; i < q->n; i++) {            /* a wall's normal is a constant, or frozen */
        if ((q->v[i] < c->nv) != wall) continue;
        part = wall ? 1 : q->w[i] / side;
        clothi_sub3(c->xa + 3 * q->v[i], c->xa + 3 * o->v0, r);
        if (!wall) b->w[i] += clothi_dot3(g, r) / side;
        clothi_flow_add(f, 0, q->v[i], part, g);
        clothi_flow_add(f, 0, o->v0, -part, g);
    }
    if (wall) return;
    clothi_turned(o->turned[0], o->turned[1], y, s);
    for (k = 0; k < 3; k++) b->n[k] -= q->radius * (side * g[k] + y[k] - s[k]);
}

/* Friction of a contact, and by `mean` (its slip: the key's mean, force the sum; gap, slip: their
 * adjoint, NULL: none) what it leaves to the next substep. */
static void clothi_back_slip(const clothi_flow *f, const clothi_contact *q, const double *Z,
                             const clothi_anchor *mean, const double *by, clothi_rates *b) {
    const cloth_collide *c = f->c;
    clothi_anchor       *m;
    const double  *u = q->last, uZ = clothi_dot3(u, Z);
    double r[3], to[3] = {0, 0, 0}, y[3], bend, less, un;
    int    i, k;
    clothi_contact_way(c, q, c->xb, r);
    bend = clothi_friction_law(c->desc.slip, q->size, &less);
    b->force += q->friction * bend * uZ;
    if (f->whole) clothi_back_coefficient(f, q, q->force * bend * uZ);
    for (k = 0; k < 3; k++) to[k] = q->limit * (bend * Z[k] - less * uZ * u[k]);
    if (by) {
        memcpy(y, u, sizeof y);
        clothi_contact_turn(c, q, y);
        for (k = 0; k < 3; k++) b->force += by[k] * (y[k] - mean->slip[k]) / mean->force;
        for (k = 0; k < 3; k++) y[k] = q->force / mean->force * by[k];
        clothi_back_turn(f, q, u, y, to, b);
    }
    un = clothi_dot3(to, q->normal);
    for (k = 0; k < 3; k++) b->n[k] -= un * r[k] + clothi_dot3(r, q->normal) * to[k];
    for (k = 0; k < 3; k++) to[k] -= un * q->normal[k];
    clothi_back_carry(f, q, to, b);
    for (i = 0; i < q->n; i++) {
        clothi_sub3(c->xb + 3 * q->v[i], c->xa + 3 * q->v[i], r);
        b->w[i] += clothi_dot3(to, r);
        clothi_flow_add(f, 1, q->v[i], q->w[i], to);
        clothi_flow_add(f, 0, q->v[i], -q->w[i], to);
    }
    m = f->whole ? clothi_anchor_of(f->to->before, f->to->nbefore, &q->key) : NULL;
    for (k = 0; m && k < 3; k++) m->slip[k] += to[k];
}

/* Energy e, force e' and guard of a contact backwards: energy, force and own their adjoints. K u^2/
 * (t (1 - u/U)^2) is of degree 2 in u and U: dF/dU = (2 F - u F')/U, de/dU = (3 e - u F)/U.
 * Where the damping ends does not matter: there e is stationary. */
static void clothi_back_normal(const cloth_collide *c, const clothi_contact *q, double energy,
                               double force, double own, clothi_rates *b) {
    const double damp = clothi_contact_damping(c, q), U = q->room, t = q->range, s = q->share;
    const double u = t - q->gap, in = t - q->start, G = CLOTHI_GUARD, v = u - (1 - G) * U;
    const int    ends = damp > 0 && in > 0;
    double       F, slope, last = 0, bend = 0, e, at = 0, room = 0, guard = 0, rise = 0;
    if (q->beside) force += own;
    if (u > q->away && u < U) {
        clothi_contact_elastic(q, q->gap, &F, &slope);
        if (ends) clothi_contact_elastic(q, t - q->away, &last, &bend);
        e = clothi_elastic_energy(q, q->gap);
        at = ends ? clothi_elastic_energy(q, t - q->away) : 0;
        room = s * (energy * (3 * (e - at) - u * F + (ends ? q->away * last : 0)) +
                    force * (2 * F - u * slope)) / U;
        last = clothi_max(in, 0) - u;
        bend = ends ? in - q->away : 0;
        b->share += force * (F - damp * last) +
                    energy * (e - at + 0.5 * damp * (last * last - bend * bend));
        b->gap -= s * (energy * (F - damp * last) + force * (slope + damp));
        if (ends) b->start += s * damp * (energy * (u - q->away) + force);
    }
    if (s < 1 && u < U) {
        clothi_barrier((1 - s) * q->stiffness, G * t, G * U, v, &guard, &rise);
        b->gap -= rise * own;
        b->share -= guard / (1 - s) * own;
        room += own * (v > 0 ? (2 * guard - v * rise) / U - (1 - G) * rise : 0);
    }
    if (!q->soft && c->approach * q->start < CLOTHI_POLE * t) b->start -= c->approach * room;
}

/* By the anchor that contacts q [n] of one key leave; their mean, and by [3]: by the slip of it.
 * NULL: nothing asks for it. */
static const clothi_anchor *clothi_back_anchor(const clothi_flow *f, const clothi_contact *q, int n,
                                               clothi_anchor *mean, double *by) {
    const cloth_collide *c = f->c;
    const clothi_anchor *m =
        f->whole || !f->a ? clothi_anchor_of(f->to->after, f->to->nafter, &q->key) : NULL;
    double               size, along;
    int                  k;
    if (!m || !clothi_anchor_mean(c, q, n, mean)) return NULL;
    memcpy(by, m->slip, sizeof m->slip);
    size = sqrt(clothi_dot3(mean->slip, mean->slip));
    if (!(size > c->desc.slip)) return m;
    along = clothi_dot3(by, mean->slip) / (size * size);
    for (k = 0; k < 3; k++) by[k] = c->desc.slip / size * (by[k] - along * mean->slip[k]);
    return m;
}

/* Contacts q [n] of one key. */
static void clothi_back_group(const clothi_flow *f, const clothi_contact *q, int n) {
    const cloth_collide *c = f->c;
    clothi_rates        *b = f->to->back, start;
    clothi_anchor        mean, *before = clothi_anchor_of(f->to->before, f->to->nbefore, &q->key);
    clothi_frame         at;
    double               by[3], Z[3], T[3], K[9], parts = 0, E = 0;
    const clothi_anchor *m = clothi_back_anchor(f, q, n, &mean, by);
    int                  i, l, k, asked = m != NULL;
    for (i = 0; f->a && i < n && !asked; i++)
        for (l = q[i].first; l < q[i].end; l++)
            asked |= clothi_max_abs(f->a + 3 * q[i].v[l], 3) > 0;
    if (!asked) return;
    memset(b, 0, (size_t)n * sizeof *b);
    for (i = 0; i < n; i++) {
        const double push = q[i].force;
        if (!(push > 0)) continue;
        memset(Z, 0, sizeof Z);
        memset(T, 0, sizeof T);
        for (l = q[i].first; f->a && l < q[i].end; l++)
            for (k = 0; k < 3; k++) Z[k] += q[i].w[l] * f->a[3 * q[i].v[l] + k];
        if (q[i].limit > 0) (void)clothi_contact_friction(c, q + i, c->xb, T, K);
        for (k = 0; k < 3; k++) T[k] -= push * q[i].normal[k], b[i].n[k] = -push * Z[k];
        for (l = q[i].first; f->a && l < q[i].end; l++)
            b[i].w[l] = clothi_dot3(T, f->a + 3 * q[i].v[l]);
        b[i].force = -clothi_dot3(Z, q[i].normal);
        clothi_back_slip(f, q + i, Z, &mean, m ? by : NULL, b + i);
        if (m && !(q[i].gap > mean.gap)) b[i].gap = m->gap, mean.gap = -HUGE_VAL;
        parts += b[i].force * q[i].at.force * q[i].at.part;
        E += clothi_eighth(q[i].at.energy);
    }
    E = sqrt(sqrt(sqrt(E)));
    for (i = 0; i < n; i++) {
        const double r = E > 0 ? q[i].at.energy / E : 0, part = q[i].at.part;
        const double energy = b[i].force * q[i].at.force * (r * r * r * r * r * r) - part * parts;
        if (!(q[i].force > 0)) continue;
        clothi_back_normal(c, q + i, E > 0 ? 7 / E * energy : 0, part * b[i].force, b[i].force,
                           b + i);
        clothi_back_frame(f, q + i, 1, &q[i].at, b + i);
        if (!f->whole) continue;
        memset(&start, 0, sizeof start);    /* of x^n: share, and the gap or what its anchor has */
        clothi_contact_frame_at(c, q + i, c->xa, &at);
        if (before && q[i].start < at.gap) before->gap += b[i].start;
        else start.gap = b[i].start;
        clothi_back_share(f, q + i, &at, b[i].share, &start);
        clothi_back_frame(f, q + i, 0, &at, &start);
    }
}

/* d/d{to} of what is above point 0 of a hold: along its normal with the face; the rest stays. */
static void clothi_back_above(const clothi_flow *f, const cloth_hold *h, double *to) {
    const int *v = f->c->faces + 3 * (size_t)(f->c->obstacle[h->slot].f0 + h->face[0]);
    double     A[3], n[3], along;
    int        k;
    clothi_hold_point(f->c, h, 0, f->c->xb, A, n);
    along = clothi_dot3(to, n);
    for (k = 0; k < 3; k++) clothi_flow_add(f, 1, v[k], along * h->weight[0][k], n);
    for (k = 0; k < 3; k++) to[k] -= along * n[k];
}

/* d/d{to} of what is held between both points: along `out` by its share of them, else by the mean
 * of their ways. Of what is led both points are one. */
static void clothi_back_between(const clothi_flow *f, const cloth_hold *h, double *to) {
    const cloth_collide *c = f->c;
    double               A[6], n[6], out[3], along;
    int                  i, k;
    (void)clothi_hold_room(c, h, c->xb, A, n, out);
    along = clothi_dot3(to, out);
    for (k = 0; k < 3; k++) to[k] -= along * out[k];
    for (i = 0; i < 6; i++) {
        const int   *v = c->faces + 3 * (size_t)(c->obstacle[h->slot].f0 + h->face[i / 3]);
        const double w = h->weight[i / 3][i % 3], part = w * (i < 3 ? 1 - h->share : h->share);
        clothi_flow_add(f, 0, v[i % 3], -0.5 * w, to);
        clothi_flow_add(f, 1, v[i % 3], 0.5 * w, to);
        clothi_flow_add(f, 1, v[i % 3], part * along, out);
    }
}

/* What holds cloth in pinches, a pull to `to`: by x, or by what carries it there and x^n. */
static void clothi_back_hold(const clothi_flow *f, const cloth_hold *h) {
    const cloth_collide *c = f->c;
    const unsigned char  look = c->look[h->vertex];
    double               to[3], H[9];
    int                  k;
    (void)clothi_hold_pull(c, h, c->xb + 3 * h->vertex, to, H);
    for (k = 0; k < 3; k++) to[k] = clothi_dot3(H + 3 * k, f->a + 3 * h->vertex);
    if (!f->whole) {
        clothi_flow_add(f, 1, h->vertex, 1, to);
        return;
    }
    for (k = 0; k < 3; k++) to[k] = -to[k];
    if (look == CLOTHI_OUT) clothi_back_above(f, h, to);
    if (look == CLOTHI_ASIDE) clothi_back_above(f, c->caught + h->vertex, to);
    if (look <= CLOTHI_BACK) clothi_back_between(f, h, to);
    clothi_flow_add(f, 0, h->vertex, 1, to);
}

/* A substep's end: its poses to those of the step; anchors before it are those after the last. */
static void clothi_back_end(clothi_flow *f, const double *share) {
    cloth_collide *c = f->c;
    clothi_adjoint *to = f->to;
    int            i, k;
    for (i = 0; i < 3 * (c->nw - c->nv); i++)
        for (k = 0; k < 2; k++) {
            to->pose[0][i] += share[k] * to->world[k][i];
            to->pose[1][i] += (1 - share[k]) * to->world[k][i];
            to->world[k][i] = 0;
        }
    CLOTHI_TAKE(clothi_anchor, to, after, before);
}

/* cloth_contact.vjp, at the x where the substep ended, of which update() was told. */
static cloth_status clothi_contact_vjp(void *user, const cloth_eval *e, const double *a,
                                       cloth_vjp *out) {
    cloth_collide  *c = (cloth_collide *)user;
    clothi_adjoint *to = c->adjoint;
    cloth_status    status = CLOTHI_ROOM(to, back, c->ncontact);
    clothi_flow     f = {c, to, out->x_n != NULL, a, {out->x_n, out->x}};
    clothi_anchor   none;
    int             i, j;
    memcpy(c->xb, e->x, 3 * (size_t)c->nv * sizeof(double));
    memset(&none, 0, sizeof none);
    for (to->nbefore = i = 0; f.whole && i < c->nnext && !status; i++) {
        none.key = c->next[i].key;
        status = CLOTHI_PUSH(to, before, none);
    }
    if (status) return status;
    for (i = 0; i < c->nholding && a; i++) clothi_back_hold(&f, c->holding + i);
    out->frozen |= c->nholding > 0;
    for (i = 0; i < c->ncontact; i = j) {
        j = clothi_group_end(c, i);
        out->frozen |= c->contact[i].force > 0 && c->contact[i].soft;
        clothi_back_group(&f, c->contact + i, j - i);
    }
    if (f.whole) clothi_back_end(&f, e->in->share);
    return CLOTH_OK;
}

/* --- forwards --- */

/* A vjp of a (NULL: by anchors alone), times d [2], dx_n and dx (NULL: 0), and how anchors move;
 * row [2 x nv x 3]: scratch. */
static cloth_status clothi_contact_worth(cloth_collide *c, const cloth_eval *e, const double *a,
                                         double *row, const double *const *d, double *worth) {
    clothi_adjoint *to = c->adjoint;
    const int       n = 3 * c->nv;
    cloth_vjp       by;
    cloth_status    status;
    int             i;
    memset(&by, 0, sizeof by);
    memset(row, 0, 2 * (size_t)n * sizeof *row);
    by.x_n = d[0] ? row : NULL, by.x = d[1] ? row + n : NULL;
    status = clothi_contact_vjp(c, e, a, &by);
    for (i = 0, *worth = 0; i < 2 * n; i++)
        if (d[i / n]) *worth += row[i] * d[i / n][i % n];
    for (i = 0; i < to->nafter; i++) {
        const clothi_anchor *p = to->after + i;
        const clothi_anchor *m = clothi_anchor_of(to->moved, to->nmoved, &p->key);
        if (m) *worth += p->gap * m->gap + clothi_dot3(p->slip, m->slip);
    }
    to->nafter = 0;
    return status;
}

/* cloth_contact.jvp, by vjp of unit vectors. */
static cloth_status clothi_contact_jvp(void *user, const cloth_eval *e, const double *dx_n,
                                       const double *dx, double *out) {
    cloth_collide  *c = (cloth_collide *)user;
    clothi_adjoint *to = c->adjoint;
    const double   *d[2] = {dx_n, dx};
    const int       n = 3 * c->nv;
    double         *a = (double *)clothi_alloc(c->hooks, 3 * (size_t)n, sizeof *a), worth = 0;
    cloth_status    status = a ? CLOTHI_ROOM(to, going, c->ncontact) : CLOTH_ERR_MEMORY;
    int             i, k;
    for (i = 0; out && i < n && !status; i++) {
        a[i] = 1;
        status = clothi_contact_worth(c, e, a, a + n, d, &worth);
        a[i] = 0;
        out[i] += worth;
    }
    for (i = 0; !out && i < c->ncontact && !status; i = clothi_group_end(c, i)) {
        clothi_anchor *go = to->going + to->ngoing++;
        for (k = 0; k < 4 && !status; k++) {
            clothi_anchor m;
            memset(&m, 0, sizeof m);
            go->key = m.key = c->contact[i].key;
            *(k ? m.slip + k - 1 : &m.gap) = 1;
            status = CLOTHI_PUSH(to, after, m);
            if (!status) status = clothi_contact_worth(c, e, NULL, a + n, d, &worth);
            *(k ? go->slip + k - 1 : &go->gap) = worth;
        }
    }
    if (!out && !status) CLOTHI_TAKE(clothi_anchor, to, moved, going);
    clothi_free(c->hooks, a);
    return status;
}

/* --- rows of impact zones --- */

/* What is of obstacles in bound and speed of row r, to them and to n and w; returns the bound's own
 * part, radius and gap. */
static double clothi_back_fixed(const clothi_flow *f, const cloth_contact_row *r,
                                const double *rate, clothi_rates *b) {
    const cloth_collide *c = f->c;
    double               bound = r->bound;
    int                  i, k;
    for (i = 0; i < r->n; i++) {
        if (r->v[i] < c->nv) continue;
        for (k = 0; k < 3; k++) {
            const double x = c->xb[3 * r->v[i] + k], v = (x - c->xa[3 * r->v[i] + k]) / c->h;
            const double to = rate[7] * x + rate[8] * v;
            bound += r->w[i] * r->normal[k] * x;
            b->n[k] -= r->w[i] * to;
            b->w[i] -= r->normal[k] * to;
        }
        clothi_flow_add(f, 1, r->v[i], -r->w[i] * (rate[7] + rate[8] / c->h), r->normal);
        clothi_flow_add(f, 0, r->v[i], r->w[i] * rate[8] / c->h, r->normal);
    }
    return bound;
}

/* One row backwards; returns whether it is one that was made at the end, which is not followed. Its
 * frame is that of the pair on the way from x^n to x, at toi, where its gap is d_min:
 * d(toi) = (d(d_min) - n . sum w dx)/(n . sum w way). d_min is a constant, or half of what the gap
 * was at x^n and its pole; the bound that gap, that along n, or 1.1 d_min. */
static int clothi_back_row(const clothi_flow *f, const cloth_contact_row *r, const double *x,
                           const double *rate) {
    const cloth_collide *c = f->c;
    const clothi_contact q = clothi_row_contact(c, r);
    const clothi_pair_id id = {r->kind, r->a, r->b};
    clothi_frame         at;
    clothi_rates         b, first;
    double xa[12], xe[12], p[12] = {0}, to[12], gap, sep = 0, come = 0, dt = 0, t;
    int    i, k, ended;
    memset(&b, 0, sizeof b);
    memset(&first, 0, sizeof first);
    memcpy(b.n, rate, sizeof b.n);
    memcpy(b.w, rate + 3, sizeof b.w);
    t = clothi_pair_thickness(c, &id, r->v);
    gap = clothi_back_fixed(f, r, rate, &b) - q.radius;
    clothi_pair_points(c, c->xa, q.v, q.n, xa);
    clothi_pair_points(c, x, q.v, q.n, xe);
    if (gap < (1 - 1e-12) * CLOTHI_GAP * t) {
        if (gap <= (1 + 1e-9) * 1.1 * (gap - r->slack)) sep = 1.1 * rate[7];
        else for (i = 0; i < 3 * q.n; i++) {            /* n . sum w x^n */
            b.n[i % 3] += rate[7] * r->w[i / 3] * xa[i];
            b.w[i / 3] += rate[7] * r->normal[i % 3] * xa[i];
            to[i] = rate[7] * r->w[i / 3] * r->normal[i % 3];
            if (i % 3 == 2) clothi_flow_add(f, 0, q.v[i / 3], 1, to + i - 2);
        }
    }
    for (i = 0; i < 3 * q.n; i++) {
        p[i] = (1 - r->toi) * xa[i] + r->toi * xe[i];
        come += r->w[i / 3] * r->normal[i % 3] * (xe[i] - xa[i]);
    }
    memcpy(at.w, r->w, sizeof at.w);
    memcpy(at.normal, r->normal, sizeof at.normal);
    for (at.gap = -q.radius, i = 0; i < 3 * q.n; i++)
        at.gap += r->w[i / 3] * r->normal[i % 3] * p[i];
    ended = q.kind != CLOTHI_VP &&
            fabs(at.gap - (gap - r->slack)) > 1e-5 * q.radius + 1e-3 * (gap - r->slack);
    if (q.kind != CLOTHI_VP) {
        clothi_back_points(&q, &at, p, &b, to);
        for (i = 0; i < 3 * q.n; i++) dt += to[i] * (xe[i] - xa[i]);
        dt = come < 0 && r->toi > 0 ? dt / come : 0;
        sep += dt;
        for (i = 0; i < q.n; i++) {
            for (k = 0; k < 3; k++) to[3 * i + k] -= dt * r->w[i] * r->normal[k];
            clothi_flow_add(f, 0, q.v[i], 1 - r->toi, to + 3 * i);
            clothi_flow_add(f, 1, q.v[i], r->toi, to + 3 * i);
        }
    }
    if (gap - r->slack > (1 - 1e-12) * CLOTHI_SEPARATION * t) return ended;
    clothi_contact_frame_at(c, &q, c->xa, &at);
    first.gap = 0.5 * sep * (1 + (c->approach * at.gap < CLOTHI_POLE * t ? c->approach : 0));
    clothi_back_frame(f, &q, 0, &at, &first);
    return ended;
}

/* cloth_contact.rows. */
static const cloth_contact_row *clothi_contact_rows(void *user, int *n) {
    const cloth_collide *c = (const cloth_collide *)user;
    *n = c->nrow;
    return c->row;
}

/* cloth_contact.rows_vjp: frames of the first pass are those of the way to where resolve() began,
 * later ones those of the way to where it ended. */
static void clothi_contact_rows_vjp(void *user, const cloth_eval *e, const double *rate,
                                    cloth_vjp *out) {
    cloth_collide *c = (cloth_collide *)user;
    clothi_flow    f = {c, c->adjoint, 1, NULL, {out->x_n, out->x}};
    int            i;
    out->frozen |= c->nholding > 0 || c->report.rigid_zones > 0;
    for (i = 0; i < c->nrow; i++, rate += CLOTH_ROW_RATES)
        if (c->row[i].pass == out->pass && clothi_max_abs(rate, CLOTH_ROW_RATES) > 0)
            out->frozen |= clothi_back_row(&f, c->row + i, e->x, rate);
    clothi_back_end(&f, e->in->share);
}

static void clothi_adjoint_free(cloth_collide *c) {
    const clothi_adjoint *to = c->adjoint;
    if (to) {
        const void *const block[] = {to->after, to->before, to->moved, to->going, to->back, to};
        (void)clothi_blocks(c->hooks, block, sizeof block / sizeof *block);
    }
    c->adjoint = NULL;
}

/* A walk backwards begins: in one block, the adjoint first. */
static cloth_status clothi_adjoint_open(cloth_collide *c) {
    const size_t   n = 3 * (size_t)(c->nw - c->nv) + 1, real = sizeof(double);
    clothi_adjoint to;
    const clothi_array need[] = {
        {&c->adjoint, 1, sizeof to}, {&to.pose[0], n, real}, {&to.pose[1], n, real},
        {&to.world[0], n, real}, {&to.world[1], n, real},
        {&to.friction, (size_t)(1 + c->nobstacle + c->desc.nparts), real}};
    clothi_adjoint_free(c);
    memset(&to, 0, sizeof to);
    to.hooks = c->hooks;
    if (clothi_arrays(c->hooks, need, sizeof need / sizeof *need)) return CLOTH_ERR_MEMORY;
    *c->adjoint = to;
    return CLOTH_OK;
}

/* What obstacles carry aims at a point of a face where it ends. */
static void clothi_back_carried(const cloth_collide *c, const double *attach) {
    const cloth_sim *s = c->sim;
    int              i, j;
    for (i = 0; attach && i < s->model->desc.max_attachments; i++) {
        const cloth_step_attachment *q = s->attach + i;
        const clothi_obstacle       *o;
        if (!q->used || !clothi_slot_valid(c, q->on - 1)) continue;     /* or a forged snapshot's */
        o = c->obstacle + q->on - 1;
        for (j = 0; j < 9 && q->other < o->nf; j++)
            c->adjoint->pose[0][3 * (o->v0 - c->nv + o->faces[3 * q->other + j / 3]) + j % 3] +=
                q->at[j / 3] * attach[3 * i + j % 3];
    }
}

/* cloth_contact.adjoint. */
static cloth_status clothi_contact_adjoint(void *user, int what, int k,
                                           const cloth_contact_grad *out) {
    cloth_collide  *c = (cloth_collide *)user;
    clothi_adjoint *to = c->adjoint;
    const size_t    n = 3 * (size_t)(c->nw - c->nv), parts = (size_t)c->desc.nparts;
    int             o;
    if (what == CLOTH_ADJOINT_PASS) c->until = k;
    if (what == CLOTH_ADJOINT_FORGET) c->seen = 0;
    if (what >= CLOTH_ADJOINT_PASS) return CLOTH_OK;
    if (what == CLOTH_ADJOINT_BEGIN) {
        if (out->friction)
            memset(out->friction, 0, (size_t)(1 + c->nobstacle) * sizeof(double));
        if (out->part_friction) memset(out->part_friction, 0, parts * sizeof(double));
        return clothi_adjoint_open(c);
    }
    if (what == CLOTH_ADJOINT_STEP) clothi_back_carried(c, out->attach);
    for (o = 0; out && out->obstacle && o < c->nobstacle; o++)
        if (c->obstacle[o].used)
            out->obstacle(k, clothi_obstacle_id(c, o),
                          to->pose[0] + 3 * (c->obstacle[o].v0 - c->nv), out->user);
    if (what == CLOTH_ADJOINT_STEP) {
        memcpy(to->pose[0], to->pose[1], n * sizeof(double));
        memset(to->pose[1], 0, n * sizeof(double));
        return CLOTH_OK;
    }
    if (out && out->friction)
        memcpy(out->friction, to->friction, (size_t)(1 + c->nobstacle) * sizeof(double));
    if (out && out->part_friction)
        memcpy(out->part_friction, to->friction + 1 + c->nobstacle, parts * sizeof(double));
    clothi_adjoint_free(c);
    return CLOTH_OK;
}

/* What the sim calls from now on. */
static void clothi_collide_connect(cloth_collide *c) {
    const cloth_contact k = {
        c, clothi_contact_begin, clothi_contact_update, clothi_contact_eval,
        clothi_contact_max_step, clothi_contact_start_at,
        clothi_contact_close, clothi_contact_resolve, clothi_contact_commit,
        clothi_contact_rollback, clothi_contact_reset, clothi_contact_save_size,
        clothi_contact_save, clothi_contact_load, clothi_contact_vjp, clothi_contact_bytes,
        clothi_contact_unsaved, clothi_contact_balance, clothi_contact_list,
        sizeof(cloth_collide_contact), clothi_contact_moves, clothi_pinch_substeps,
        clothi_contact_orphan, clothi_contact_adjoint, clothi_contact_rows,
        clothi_contact_rows_vjp, clothi_contact_jvp};
    (void)cloth_sim_set_contact(c->sim, &k);
}

/* ===== [9.1] CHANGES =========================================================================
 *
 * clothsim.h [11.1]. MIT licence: the text in LICENSE holds for this file.
 */

#ifdef CLOTHI_OWN_SQRT
#  pragma pop_macro("sqrt")
#endif
#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
