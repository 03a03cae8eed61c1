/* clothsim_grad.h - how the motion of cloth depends on its causes.                version 0.2.0
 * SPDX-License-Identifier: MIT
 *
 * A tape records the steps of a sim. One call walks it backwards and returns the derivative of any
 * loss on the trajectory with respect to everything that caused it. C99, libc and libm only.
 *
 * In ONE .c file:        #define CLOTHSIM_IMPLEMENTATION
 *                        #include "clothsim_grad.h"
 * everywhere else:       #include "clothsim_grad.h"            (it includes clothsim.h)
 *
 * CONTENTS
 *   read before the first line of your own
 *     [1.1] QUICK START                      [1.2] WHAT THE DERIVATIVE MEANS, WHAT IT COSTS
 *     [1.3] REFERENCES
 *   the interface
 *     [2.1] TAPE                             [2.2] GRADIENT
 *     [2.3] CHECK                            [2.4] LOSSES
 *     [2.5] SIMULATION LAYER                 [2.6] EMBEDDED GRAPH
 *   the implementation, bottom-up
 *     [3.1] THE TAPE
 *     [4.1] A SUBSTEP, LINEARISED            [4.2] ITS ADJOINT
 *     [4.3] LEAPFROG                         [4.4] FROM MASSES AND LAME CONSTANTS TO MATERIALS
 *     [5.1] BACKWARDS                        [5.2] TANGENT, CHECK
 *     [6.1] TARGETS, NEAREST POINTS          [6.2] FRAMES, SIMULATED
 *     [6.3] A GRAPH THAT CARRIES A MESH
 *     [7.1] CHANGES
 */

/* ===== [1.1] QUICK START =====================================================================
 *
 * How far the free corner of a sheet moves at the end with its stiffness, and with its first speed.
 *
 * ---- 18_gradient.c ----
 *     #define CLOTHSIM_IMPLEMENTATION
 *     #include "clothsim_grad.h"
 *     #include <stdio.h>
 *
 *     enum { NV = 400, STEPS = 30 };
 *
 *     static void corner(int k, const double *x, const double *v, double *gx, double *gv,
 *                        void *user) {                       // L = its y after the last step
 *         (void)x, (void)v, (void)gv, (void)user;
 *         if (k == STEPS) gx[3 * (NV - 1) + 1] += 1;
 *     }
 *
 *     int main(void) {
 *         static double     v0[3 * NV];
 *         double            stiffness;
 *         cloth_mesh       *sheet = NULL;
 *         cloth_model      *model = NULL;
 *         cloth_sim        *sim = NULL;
 *         cloth_tape       *tape = NULL;
 *         cloth_grad        grad = {0};
 *         cloth_grad_report report;
 *         cloth_pin         pins[2] = {{0, CLOTH_AXIS_ALL}, {19, CLOTH_AXIS_ALL}};
 *         cloth_desc        desc = cloth_desc_default();
 *         int               frame, v;
 *
 *         if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 20, 20, 1.0, 1.0, &sheet)) return 1;
 *         for (v = 0; v < NV; v++)                            // laid flat, rounding would choose
 *             sheet->x[3 * v + 1] = 0.04 * sin(5 * sheet->x[3 * v] + 3 * sheet->x[3 * v + 2]);
 *         cloth_desc_set_mesh(&desc, sheet);                  // where it buckles
 *         desc.npins = 2, desc.pins = pins;
 *         desc.material.bending = 1e-3;                       // N m: what is softer wrinkles
 *         desc.tolerance = 1e-8;                              // m: derivatives want more than eyes
 *         if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
 *         if (cloth_tape_create(sim, NULL, &tape)) return 1;
 *         for (frame = 0; frame < STEPS; frame++)
 *             if (cloth_step(sim, 1.0 / 60, NULL)) return 1;
 *         grad.membrane = &stiffness, grad.v0 = v0;           // what is asked for
 *         if (cloth_grad_backward(tape, corner, NULL, &grad, &report)) return 1;
 *         printf("dL/dY = %.3e m per N/m, dL/dv0y of that corner = %.4f s; %s\n", stiffness,
 *                v0[3 * (NV - 1) + 1], report.valid ? "valid" : report.why);
 *         cloth_tape_destroy(tape), cloth_sim_destroy(sim), cloth_model_destroy(model);
 *         cloth_mesh_destroy(NULL, sheet);
 *         return 0;
 *     }
 * ---- end ----
 */

/* ===== [1.2] WHAT THE DERIVATIVE MEANS, WHAT IT COSTS ========================================
 *
 * A step of clothsim.h ends at a minimum x of phi(x; p), p all that caused it. There grad phi = 0,
 * and it stays 0 when p moves by dp and x by dx:
 *
 *     H dx + d(grad phi)/dp dp = 0,      H = d2 phi/dx2, exact, not projected
 *
 * The tangent follows dx from step to step. The adjoint goes the other way: with a = dL/dx it
 * solves H z = a, and dL/dp gets -z' d(grad phi)/dp for every p at once. One linear solve a step
 * and one pass over the elements; no iteration, whatever the step took.
 *
 * IT IS EXACT for the steps that were taken: the same h, the same substeps, every choice that the
 * step made on its way (with or without history, asleep or not) a constant. It says nothing of
 * what the motion would do were a choice to change, and the motion of sheets that buckle is
 * chaotic: a derivative over a hundred steps of that is right and useless.
 *
 * HOW FAR TO TRUST IT. report.valid is 1 when nothing speaks against it; report.doubt says what
 * does and report.step where first:
 *   CLOTH_GRAD_SADDLE     H has a direction of negative curvature: the step ended on a saddle
 *   CLOTH_GRAD_EARLY      a forward step stopped so far from its minimum (desc.tolerance,
 *                         desc.max_newton) that the gradient is off by more than options.early,
 *                         or with contact at its cap of iterations
 *   CLOTH_GRAD_RESIDUAL   the adjoint system was not solved to options.tolerance
 *   CLOTH_GRAD_FROZEN     contact took for constant what moves (clothsim_collide.h [8.8])
 *
 * COST. A backward step is one assembly, one factorisation and two to three passes over the
 * elements: 0.4 of a step to 1e-8 m. LEAPFROG: each step anew and one pass a kick, 4 to 5 of a
 * step, however many causes are asked for. Memory: the motion of every step (12 to 18 numbers a
 * vertex, 9 more with contact), or options.bytes, and then part of the steps are run anew. A sim
 * without a tape pays nothing.
 *
 * CONTACT of clothsim_collide.h is part of it: its potential, friction with the normal forces and
 * frames of the step's end, and what anchors carry to the next step. Which pairs there are is a
 * choice. Its Jacobian is not symmetric: GCR, preconditioned by the factor, takes the place of
 * one solve. It asks more of the forward steps: desc.tolerance 1e-8 m and below; a step that its
 * cap ended is called in doubt.
 *
 * LEAPFROG's contact is impact zones: the derivative goes through their programs, by the rows that
 * push, and through what made these rows (clothsim_collide.h [8.8]). report.margin says how far, in
 * m, the nearest row is from pushing no more or beginning to.
 */

/* ===== [1.3] REFERENCES ======================================================================
 *
 * [GW08]   Griewank, Walther: Evaluating Derivatives, 2nd ed. SIAM 2008. Adjoints, checkpoints.
 * [CLPS03] Cao, Li, Petzold, Serban: Adjoint Sensitivity Analysis for Differential-Algebraic
 *          Equations, SIAM J. Sci. Comput. 24, 2003.
 * [R82]    Ridders: Accurate computation of F'(x) and F'(x) F''(x). Adv. Eng. Software 4, 1982.
 * [EES83]  Eisenstat, Elman, Schultz: Variational iterative methods for nonsymmetric systems of
 *          linear equations, SIAM J. Numer. Anal. 20, 1983.
 * [LHT21]  Li, Habermann, Thomaszewski, Coros, Beeler, Theobalt: Deep physics-aware inference of
 *          cloth deformation for monocular human performance capture, 3DV 2021.
 * [SSP07]  Sumner, Schmid, Pauly: Embedded deformation for shape manipulation, SIGGRAPH 2007.
 */

#ifndef CLOTHSIM_GRAD_H
#define CLOTHSIM_GRAD_H

#include "clothsim.h"

#if CLOTH_VERSION_NUM < 200
#error "clothsim_grad.h needs clothsim.h 0.2.0 or newer"
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.1] TAPE ============================================================================
 *
 * A tape records every accepted step of a sim from its creation on, cloth_solve_static() too, with
 * what was pinned, attached, pushed, blown and what material it had; all may change between steps.
 * What moves the state otherwise (cloth_sim_restore, _reset, cloth_step_replay, a write to
 * cloth_sim_state, a teleport, an obstacle that comes or goes) ends the tape: the next step is not
 * recorded and a sentence says so; what was recorded stays good, with the obstacles that it had. So
 * it is when memory or the budget is out, and when a host's term is added, which none knows of that
 * was recorded before. */

typedef struct cloth_tape cloth_tape;

#define CLOTH_DEFAULT_ADJOINT_TOLERANCE 1e-10
#define CLOTH_DEFAULT_EARLY             1e-3

typedef struct cloth_tape_options {
    uint32_t     cookie;        /* set by cloth_tape_options_default()                         */
    size_t       bytes;         /* most that the tape may hold, its work included; 0: what it
                                   takes. The linear solver's memory is the sim's              */
    cloth_linear linear;        /* of the adjoint solve; AUTO: CHOLESKY                        */
    double       tolerance;     /* relative residual of it, default 1e-10                      */
    double       early;         /* relative error by early stops that makes a gradient invalid;
                                   default 1e-3, 0: not looked at (saves a gradient a step)    */
} cloth_tape_options;

CLOTH_API cloth_tape_options cloth_tape_options_default(void);

/* in   sim   without another tape; the tape may outlive it, but is then only to be destroyed
 * in   opt   NULL: defaults
 * out  *out  owned: cloth_tape_destroy(); NULL on failure
 * returns CLOTH_OK; _ARGUMENT (NULL, a second tape); _UNINIT; _NONFINITE; _MEMORY;
 *   _CAPACITY: opt->bytes is below what one step takes (LEAPFROG: of desc.substeps), as is said
 * contract: alloc the budget's fixed part | threads: that of the sim */
CLOTH_API cloth_status cloth_tape_create(cloth_sim *sim, const cloth_tape_options *opt,
                                         cloth_tape **out);
CLOTH_API void   cloth_tape_destroy(cloth_tape *tape);      /* NULL allowed                    */
CLOTH_API int    cloth_tape_steps(const cloth_tape *tape);  /* recorded; 0 for NULL            */
/* Bytes held now, and the most since create (may be NULL). */
CLOTH_API size_t cloth_tape_bytes(const cloth_tape *tape, size_t *most);
/* NULL while it records; else the sentence that says what ended it. Borrowed. */
CLOTH_API const char *cloth_tape_ended(const cloth_tape *tape);

/* ===== [2.2] GRADIENT ======================================================================== */

/* Adds dL/dx, dL/dv [nv x 3] of the state x, v after recorded step k = n .. 1, then of the start,
 * k = 0. gx and gv come as zeros. It may not call the sim. */
typedef void cloth_loss_fn(int k, const double *x, const double *v, double *gx, double *gv,
                           void *user);

struct cloth_obstacle;                      /* clothsim_collide.h                              */

/* Where results go: the caller's arrays; NULL: not wanted. Written, not added to. Per region, in
 * the units of cloth_material: the derivative by young*thickness (or by membrane where that is
 * used) is `membrane`, by D `bending`; where D follows from the other fields (bending < 0) they get
 * its share. What is given anew at every step has a derivative by its value at each step, as given
 * (cloth_collide_step may go a part of the way): one that is kept over many steps has the sum of
 * those. Parameters of a host's own term are its own: its vjp adds a' d(grad)/d{..} to arrays that
 * its `user` has, where out->own is 1, once a substep; then they hold the loss's derivative. */
typedef struct cloth_grad {
    double *x0, *v0;            /* [nv x 3]    start; pins' targets, ties' offsets and poses of
                                   attachments stay                                            */
    double *density;            /* [nregions]  0 where masses are given                        */
    double *membrane, *poisson; /* [nregions]                                                  */
    double *bending, *damping;  /* [nregions]                                                  */
    double *X;                  /* [nf x 3 x 2], through lumped masses too                     */
    double *theta0, *mass;      /* [nh], [nv]  as in cloth_params; mass: as if it were given   */
    double *gravity, *wind;     /* [3]         of all steps together                           */
    double *force;              /* [steps x nv x 3]                                            */
    double *pin;                /* [steps x nv x 3] by the target of a pinned vertex, else 0;
                                   where ties are, at the leader                               */
    double *friction;           /* [1 + slots of obstacles, also of those that were removed]: by
                                   cloth on cloth, then by slot, the low half of an id less 1  */
    void  (*obstacle)(int k, struct cloth_obstacle id, const double *g_x_end, void *user);
    void   *user;               /* of obstacle: k = n .. 1, by where recorded step k was to take
                                   its vertices; then k = 0, by them at the start              */
    double *part_friction;      /* [parts] by cloth_collide_part.friction                      */
    double *hinge_scale;        /* [nh]                                                        */
    double *attach;             /* [steps x max_attachments x 3] by the targets                */
    double *attach_k;           /* [max_attachments] of all steps together                     */
} cloth_grad;

enum {                          /* report.doubt                                                */
    CLOTH_GRAD_SADDLE = 1, CLOTH_GRAD_EARLY = 2, CLOTH_GRAD_RESIDUAL = 4, CLOTH_GRAD_FROZEN = 8
};

typedef struct cloth_grad_report {
    cloth_status status;        /* as returned                                                 */
    int      valid;             /* 1: CLOTH_OK and no doubt                                    */
    unsigned doubt;             /* CLOTH_GRAD_... or'ed                                        */
    const char *why;            /* the first doubt in words, "" without one; static            */
    int      step;              /* recorded step of the first doubt, -1                        */
    int      steps;             /* of the tape                                                 */
    int      replayed;          /* steps run anew for want of memory, or of LEAPFROG's path    */
    int      solves, iterations, factorizations;
    int      negative;          /* substeps whose H is not positive definite                   */
    double   residual;          /* largest relative residual of an adjoint solve               */
    double   left_m;            /* m, largest Newton update that a forward step left undone    */
    double   early;             /* relative error of the gradient by that, estimated           */
    size_t   bytes;             /* most that the tape held                                     */
    double   ms;                /* 0 without a clock hook                                      */
    int      rows, redundant;   /* LEAPFROG's contact: rows that push, of all substeps; of them,
                                   that follow from others and are dropped                     */
    double   margin;            /* m, of the row that is nearest to a change; HUGE_VAL: no row */
} cloth_grad_report;

/* The derivative of the loss by all that `out` asks for. The sim steps on from where it was: its
 * hash is the same before and after, but contact's queries know of none till it steps awake. May be
 * called again, with other losses, and while recording.
 * in   loss  called for k = n .. 0
 * out  out   on failure its arrays are zero, but by _HANDLE, and friction's if it is _UNSUPPORTED
 *            or _ARGUMENT
 * out  rep   may be NULL
 * returns CLOTH_OK; _ARGUMENT (NULL, no step recorded); _HANDLE: the sim is destroyed;
 *   _UNSUPPORTED: contact or a host's term without vjp, friction or obstacle without contact;
 *   _NONFINITE: the loss wrote NaN or infinity (step and vertex are named); _MEMORY; _CAPACITY:
 *   the budget; _CANCELLED; _FORMAT: an obstacle, a host's term or contact has
 *   come or gone since
 * contract: alloc scratch at each call | one linear solve a substep | the same bits for any budget
 *   and any worker count | threads: that of the sim */
CLOTH_API cloth_status cloth_grad_backward(cloth_tape *tape, cloth_loss_fn *loss, void *user,
                                           cloth_grad *out, cloth_grad_report *rep);

/* ===== [2.3] CHECK ===========================================================================
 *
 * Is the gradient of my scene right? The run is made once on a tape and walked back; then, for each
 * cause, again and again with the cause moved along a random direction, and differences are
 * extrapolated to what the adjoint should be. The forward steps must converge far better than they
 * need to for eyes: desc.tolerance 1e-10 m or less. */

/* What the host does from the sim's state on: moves, pins, forces, steps; each time the same. */
typedef cloth_status cloth_run_fn(cloth_sim *sim, void *user);

#define CLOTH_CHECK_ROWS 16                 /* most rows of a table                            */

typedef struct cloth_check_row {
    const char *cause;          /* a field of cloth_grad; "dot product": adjoint against tangent,
                                   by x0, v0 and gravity at once, equal to rounding            */
    double adjoint, other;      /* derivative along a direction; by differences, or tangent    */
    double off, doubt;          /* relative: how far they are apart; how far differences are
                                   from knowing it                                             */
} cloth_check_row;

/* History, anchors and the time asleep are dropped where the run begins. After the call the sim is
 * where it was. What the run sets itself (gravity, wind, materials) has no row.
 * out  row   [CLOTH_CHECK_ROWS]
 * out  *rows how many
 * out  rep   of the gradient; may be NULL
 * returns CLOTH_OK: the table is made, whatever it says; _ARGUMENT (NULL, a tape is there, a run of
 *   another length); as cloth_grad_backward, and as run: that ends the check
 * contract: alloc scratch | cost 13 runs a cause, 3 nv passes over the terms a substep or kick,
 *   with contact some ten times as many */
CLOTH_API cloth_status cloth_grad_check(cloth_sim *sim, cloth_run_fn *run, void *run_user,
                                        cloth_loss_fn *loss, void *user,
                                        cloth_check_row *row, int *rows, cloth_grad_report *rep);

/* ===== [2.4] LOSSES ==========================================================================
 *
 * What a fit asks for, as plain functions of positions. Here and in [2.5], [2.6] value and gradient
 * are ADDED to what is there, nothing by a refusal; so losses add up, and one is one line of a
 * cloth_loss_fn: `my->status |= cloth_loss_targets(my->targets + k, x, &my->loss, gx);`. A host's
 * own loss is a cloth_loss_fn too. */

#define CLOTH_DEFAULT_BETA_ATTACH 0.2       /* [LHT21]                                         */

/* L = beta sum_i w_i |x(face_i, bary_i) - target_i|^2, x(..) the point of the cloth there. faces
 * NULL: one target a vertex, L = beta sum_v w_v |x_v - target_v|^2. What has weight 0 or face -1 is
 * not looked at; all other numbers must be finite. */
typedef struct cloth_targets {
    const cloth_hooks *hooks;   /* NULL, or whose log gets the sentences                       */
    int           nv, nf;       /* of the cloth                                                */
    const int    *faces;        /* [nf x 3], or NULL                                           */
    int           n;            /* targets; nv without faces                                   */
    const int    *face;         /* [n]      not read without faces, as bary                    */
    const double *bary;         /* [n x 3]                                                     */
    const double *target;       /* [n x 3]  m                                                  */
    const double *weight;       /* [n] >= 0; NULL: 1                                           */
    double        beta;         /* 1/m^2, default 0.2                                          */
} cloth_targets;

CLOTH_API cloth_targets cloth_targets_default(void);

/* out  loss, g_x  may be NULL: L, dL/dx [nv x 3] are added
 * returns CLOTH_OK; _ARGUMENT (NULL, a count, an index, a weight or beta below 0); _NONFINITE
 * contract: alloc none | cost O(n + nf) | threads: distinct outputs */
CLOTH_API cloth_status cloth_loss_targets(const cloth_targets *q, const double *x, double *loss,
                                          double *g_x);

/* Squared distance, m^2, of p [3] from the triangle x [3 x 3]; bary [3] of its nearest point, >= 0
 * and of sum 1 (any point, where lengths are not within 1e-60 .. 1e60 m). Beyond a side that is of
 * a side or a corner, not the foot of the perpendicular with coordinates clamped and divided. */
CLOTH_API double cloth_nearest_on_triangle(const double *p, const double *x, double *bary);

/* For each point [n x 3] the nearest of a mesh, of several faces the first. face and bary fixed,
 * cloth_loss_targets has the derivative of the distance itself: a nearest point that slides changes
 * nothing to first order.
 * in   most   m; a point farther away gets face -1; HUGE_VAL: none does
 * out  face   [n], bary [n x 3]
 * returns CLOTH_OK, _ARGUMENT, _NONFINITE
 * contract: alloc none | cost O(n nf), about 7 ns a pair | threads: distinct outputs */
CLOTH_API cloth_status cloth_nearest_on_mesh(const cloth_hooks *hooks, int nv, const double *x,
                                             int nf, const int *faces, int n, const double *point,
                                             double most, int *face, double *bary);

/* ===== [2.5] SIMULATION LAYER ================================================================
 *
 * Do the frames x_0 .. x_(F-1) that somebody predicts move as cloth does? [LHT21]. The sim starts
 * at x_0 with v = (x_1 - x_0)/h and takes a step to each next frame, to y_k for the x_k predicted:
 *
 *     L = beta sum_k 1/nv sum_v |y_kv - x_kv|^2,      k = 1 .. F-1 but for those that failed
 *
 * A frame FAILS whose step has no result, or whose y_k is farther from x_k than `most` (root of the
 * mean square); it has no part in loss or gradient, and the next one is simulated from x_k, v =
 * (x_(k+1) - x_k)/h. Which frames fail is a choice: L jumps there, its gradient does not know.
 *
 * WHICH DIFFERENCE. From x_0 with v = (x_1 - x_0)/h an implicit Euler step ends at y_1 = x_1 + h^2
 * M^-1 F(y_1), F all forces but inertia: beyond x_1 wherever x_1 is, 1.1 cm in free fall at 1/30 s;
 * L is 0 at rest alone. With `backward` the sim starts at x_1, v = (x_1 - x_0)/h, as implicit Euler
 * has there: frames that it made have L = 0, and of a true motion y_2 is right to h^3. */

#define CLOTH_DEFAULT_FRAMES   5
#define CLOTH_DEFAULT_BETA_SIM 20000.0      /* 1/m^2 [LHT21]                                   */
#define CLOTH_DEFAULT_SIM_MOST 0.1          /* m                                               */

typedef struct cloth_layer {
    uint32_t      cookie;       /* set by cloth_layer_default()                                */
    int           frames;       /* F >= 2 (backward: 3), default 5                             */
    double        h;            /* s between frames; to be set, as x                           */
    const double *x;            /* [F x nv x 3] m, the predictions                             */
    int           backward;     /* differences; default 0                                      */
    double        beta, most;   /* 1/m^2, m; defaults 20000, 0.1                               */
    /* Puts what moves; NULL: nothing does. start 1: obstacles at once where they are at `frame`, as
     * the cloth is already (cloth_collide_teleport); 0: targets of the step to `frame` (.._move,
     * _pin). CLOTH_ERR_STEP, _MESH, _NONFINITE, _NUMERIC fail the frame, as the step's own do. */
    cloth_status (*place)(cloth_sim *sim, int frame, int start, void *user);
    void         *user;         /* of place and step                                           */
    double       *y;            /* NULL, or [F x nv x 3]: y_k; frames without are the prediction */
    const cloth_tape_options *tape;         /* NULL: defaults                                  */
    /* Goes on by h to what place() said; NULL: one cloth_step(). Several shorter steps where one
     * fails (cloth_collide_step() until its fractions make 1) keep a frame that else fails. */
    cloth_status (*step)(cloth_sim *sim, double h, void *user);
} cloth_layer;

CLOTH_API cloth_layer cloth_layer_default(void);

typedef struct cloth_layer_report {
    cloth_status status;        /* as returned                                                 */
    int          used, failed;  /* frames; together F - 1 (backward: F - 2)                    */
    int          beyond;        /* failed ones that had a result                               */
    int          starts;        /* 1 and one for each failed frame before the last             */
    int          first_failed;  /* frame, -1                                                   */
    cloth_status failure;       /* of that one; CLOTH_OK: it was too far                       */
    double       worst;         /* m, largest distance of a used frame, root of the mean square */
    cloth_grad_report grad;     /* counts and early: sums; residual, left_m, bytes: largest;
                                   doubt: of any; step: the frame of the first doubt, or -1    */
} cloth_layer_report;

/* The sim brings what the frames do not say: material, pins, forces, obstacles. It is put there
 * before each start, without history, and where it was after the call, by its hash; its recorder
 * hears nothing, its log why frames fail. They may begin intersecting (CLOTH_INITIAL_EXEMPT).
 * out  loss, g_x, rep  may be NULL: L, dL/dx [F x nv x 3] are added; without g_x no tape is made
 * returns CLOTH_OK, also where every frame failed; _UNINIT; _ARGUMENT (NULL, a number out of range,
 *   a tape is there, place() did what ends one, step() made none); _NONFINITE: a prediction; as
 *   cloth_grad_backward
 * contract: alloc scratch, a tape | cost F - 1 steps and as many backwards | threads: of the sim */
CLOTH_API cloth_status cloth_layer_loss(cloth_sim *sim, const cloth_layer *layer, double *loss,
                                        double *g_x, cloth_layer_report *rep);

/* ===== [2.6] EMBEDDED GRAPH ==================================================================
 *
 * A mesh moves with few numbers: nodes, each with a rotation and a translation, vertices bound to
 * several [SSP07]. Node j at g_j, parameters p_j = (r_j, t_j), r_j a rotation vector:
 *
 *     x_v = sum_j w_vj (R_j (X_v - g_j) + g_j + t_j),     sum_j w_vj = 1,    R = exp [r]x
 *
 * Nodes by farthest points: vertex `first`, then each time the vertex that is farthest from all
 * nodes. Bound to its k nearest nodes, d_0 the distance of the next one (of nn = k: twice that of
 * the last), a vertex has w_vj = (1 - |X_v - g_j|/d_0)^2 over their sum. Nodes that share a vertex
 * are neighbours. As stiff as may be:
 *
 *     L = beta sum_j sum_(k beside j) |R_j (g_k - g_j) + g_j + t_j - g_k - t_k|^2
 *
 * Distances are straight: parts near in X and far along the cloth want graphs of their own, or an X
 * that spreads them. Derivatives are exact, also at r = 0. */

typedef struct cloth_graph {    /* read; weights may be written                                */
    int     nv, nn, nedge;      /* vertices, nodes, pairs of neighbours                        */
    double *g;                  /* [nn x 3]     m, node at rest                                */
    int    *start;              /* [nn + 1]     ranges of vertex and weight by node            */
    int    *vertex;             /* [start[nn]]  of whom it carries a part, increasing          */
    double *weight;             /* [start[nn]]                                                 */
    int    *edge;               /* [nedge x 2]  a < b, by a, then b                            */
} cloth_graph;

/* in   X     [nv x 3] m, the template
 * in   nn    nodes, k of them for each vertex, 1 <= k <= nn <= nv
 * out  *out  owned: cloth_graph_destroy with the same hooks; NULL on failure
 * returns CLOTH_OK; _ARGUMENT (NULL, a count, first; under nn places in X); _NONFINITE; _MEMORY
 * contract: alloc graph and scratch | cost O(nv (nn + k^2)) | deterministic */
CLOTH_API cloth_status cloth_graph_create(const cloth_hooks *hooks, int nv, const double *X, int nn,
                                          int k, int first, cloth_graph **out);
CLOTH_API void cloth_graph_destroy(const cloth_hooks *hooks, cloth_graph *graph);   /* or NULL */

/* x [nv x 3] from X [nv x 3] and p [nn x 6]; x is not X. Returns CLOTH_OK, _ARGUMENT, _NONFINITE
 * contract, also of the next two: alloc none | cost O(nv k) | threads: distinct outputs */
CLOTH_API cloth_status cloth_graph_deform(const cloth_hooks *hooks, const cloth_graph *graph,
                                          const double *X, const double *p, double *x);
/* From a = dL/dx [nv x 3]: dL/dp is added to g_p [nn x 6], dL/dX at constant nodes and weights to
 * g_X [nv x 3]; either may be NULL. */
CLOTH_API cloth_status cloth_graph_vjp(const cloth_hooks *hooks, const cloth_graph *graph,
                                       const double *X, const double *p, const double *a,
                                       double *g_p, double *g_X);
/* L above is added to *loss, dL/dp to g_p; either may be NULL. */
CLOTH_API cloth_status cloth_graph_rigidity(const cloth_hooks *hooks, const cloth_graph *graph,
                                            const double *p, double beta, double *loss,
                                            double *g_p);

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_GRAD_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_GRAD_IMPLEMENTED)
#define CLOTHSIM_GRAD_IMPLEMENTED

#include "clothsim.h"       /* its implementation, where only the interface has been seen so far */
#ifdef CLOTHI_OWN_SQRT
#  pragma push_macro("sqrt")
#  undef sqrt
#  define sqrt clothi_sqrt
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] THE TAPE ========================================================================
 *
 *   step      0          1          2          3            a step is a function of
 *          +--------+ +--------+ +--------+ +--------+        motion  what a step moves: x v,
 *   motion | slot   | |   .    | | slot   | |   .    | end            history
 *          +--------+ +--------+ +--------+ +--------+        input   what the host says: pins,
 *   input    b0    ^    b1   ^     b2   ^     b3                      forces, ..., params, and the
 *            (only the words that change are kept)                    states of hosts' terms
 *
 * The motion at the start of step k follows from slots before it and the inputs since, to the last
 * bit: steps are replayed. So slots may be dropped, inputs not. Inputs are kept as words that
 * differ, b(k-1) XOR b(k), an operation that goes both ways: a cursor that holds b(k) walks to
 * b(k-1) and to b(k+1) alike.
 *
 * Under a budget B slots are thinned: when the next one does not fit, every second one goes and the
 * spacing doubles. Going backwards what lies between two slots is run anew, into what is free; an
 * interval that is too long for it is halved, the second half first (bisection [GW08]): with room
 * for s slots more a run of n steps between two slots costs at most about n log2(n) steps.
 *
 * That nobody but steps moved the sim is seen, not told: the motion at a step's start is compared
 * with that at the end of the step before. Dropped history (a new material) is no such move.
 * checked: tests/test_tape.c
 */

#define CLOTHI_TAPE_COOKIE 0x7a9e0010u
#define CLOTHI_GRAD_KRYLOV 30               /* directions of GCR, [4.2], between restarts      */
#define CLOTHI_BLOCK (CLOTHI_ALIGN + sizeof(clothi_block_header))   /* beside what is in it      */

enum { CLOTHI_MOTION, CLOTHI_INPUTS, CLOTHI_PARAMS };   /* kinds of clothi_fields             */
enum { CLOTHI_TAPE_RECORD, CLOTHI_TAPE_DEAF, CLOTHI_TAPE_TRACE };

/* Of a substep: implicit Euler for BDF2; there is a history after it; contact had less room. */
enum { CLOTHI_HOW_EULER = 1, CLOTHI_HOW_KEPT = 2, CLOTHI_HOW_SQUEEZED = 4 };

typedef struct clothi_taped {               /* one step                                        */
    double   h, fraction;                   /* s, 0: statics; as the sim's                     */
    int      dropped;                       /* before it: bit 1 history, bit 2 sleep           */
    int      asleep;                        /* it moved t alone                                */
    int      params;                        /* its params are others than the step's before    */
    int      slept;                         /* it put the sim to sleep: v became 0             */
    int      inexact;                       /* with contact, whose search may end anywhere: it
                                               did before it converged                         */
    int      cut;                           /* the host's time was up: no replay leads there   */
    int      substeps;                      /* LEAPFROG: kicks                                 */
    size_t   size, units, nword;            /* bytes of its input, of units in it; words that
                                               differ                                          */
    uint64_t *word;                         /* [nword], then [nword] uint32_t: which ones      */
    const unsigned char *how;               /* [substeps] CLOTHI_HOW_... behind them; not of
                                               LEAPFROG                                        */
    unsigned char *slot;                    /* motion at its start, then the ends of its
                                               substeps but the last [3 nv]; NULL: dropped     */
} clothi_taped;

struct cloth_tape {
    cloth_hooks   hooks;                    /* the model's: the sim may go first               */
    cloth_tape_options opt;
    cloth_sim    *sim;                      /* NULL: destroyed                                 */
    const char   *ended;                    /* sentence, or NULL                               */
    cloth_status  ended_by;
    int           mode;
    int           n, capacity, spacing;
    clothi_taped *step;                     /* [capacity]                                      */
    size_t        nv3;                      /* 3 nv                                            */
    size_t        motion, fixed_input, params, slot;        /* bytes; params: of the input     */
    unsigned char *start, *end;             /* [motion] of the step that is recorded           */
    unsigned char *input, *next;            /* [room] input of the last step, of the next one  */
    size_t        room;
    double       *trace;                    /* [trace_room] ends of substeps under way; LEAPFROG:
                                               x and v at each kick                            */
    size_t        trace_room;               /* doubles                                         */
    int           traced;                   /* substeps in it                                  */
    int           lost;                     /* trace: memory is out                            */
    int           lags;                     /* statics with what is lagged is among the steps  */
    unsigned char *how;                     /* [substeps] of the step that is recorded         */
    size_t        path;                     /* bytes of the longest trace of LEAPFROG          */
    size_t        bytes, most;
    size_t        work;                     /* bytes that a walk backwards takes, beside slots */
};

static size_t clothi_max_size(size_t a, size_t b) { return a > b ? a : b; }

static void *clothi_tape_alloc(cloth_tape *t, size_t count, size_t size) {
    void *p = clothi_alloc(&t->hooks, count, size);
    t->bytes += clothi_block_size(p);
    if (t->bytes > t->most) t->most = t->bytes;
    return p;
}

static void clothi_tape_free(cloth_tape *t, const void *p) {
    t->bytes -= clothi_block_size(p);
    clothi_free(&t->hooks, p);
}

/* --- the fields of a sim by kind --- */

static int clothi_field_kind(const clothi_field *q) {
    return q->flags & CLOTHI_PARAM ? CLOTHI_PARAMS
                                   : q->flags & CLOTHI_INPUT ? CLOTHI_INPUTS : CLOTHI_MOTION;
}

/* Fields of a kind from the sim (CLOTHI_SAVE) or to it (CLOTHI_LOAD); returns their bytes. */
static size_t clothi_tape_walk(const cloth_sim *s, int kind, int verb, const void *packed) {
    const clothi_field *q = clothi_fields;
    clothi_walk         w;
    memset(&w, 0, sizeof w);
    w.verb = verb;
    w.buf = (unsigned char *)(uintptr_t)packed;
    for (; q < clothi_fields + CLOTHI_FIELDS; q++)
        if (clothi_field_kind(q) == kind) clothi_walk_field(s, q, &w);
    return w.at;
}

/* States of hosts' terms and of contact. */
static size_t clothi_tape_units(const cloth_sim *s, int verb, const void *packed, size_t at) {
    clothi_walk w;
    memset(&w, 0, sizeof w);
    w.verb = verb;
    w.buf = (unsigned char *)(uintptr_t)packed;
    w.at = at;
    clothi_walk_units(s, &w, CLOTHI_MAX_TERMS);
    return w.at - at;
}

/* A record's state into motion and input; returns where its units begin. */
static size_t clothi_tape_split(const cloth_sim *s, const void *state, unsigned char *motion,
                                unsigned char *input) {
    const unsigned char *from = (const unsigned char *)state;
    size_t               f, at = 0;
    for (f = 0; f < CLOTHI_FIELDS; f++) {
        const clothi_field *q = clothi_fields + f;
        const int           kind = clothi_field_kind(q);
        size_t              n = clothi_field_count(s, q) * q->size;
        if (n == 0 || kind == CLOTHI_PARAMS) continue;
        n += CLOTHI_PAD8(n);
        memcpy(kind == CLOTHI_MOTION ? motion : input, from + at, n);
        *(kind == CLOTHI_MOTION ? &motion : &input) += n;
        at += n;
    }
    return at;
}

/* What of the motion changed between two steps: 0 nothing, bit 1 history was dropped, bit 2 the sim
 * was woken; -1 the state was written. */
static int clothi_tape_moved(const cloth_sim *s, const unsigned char *end,
                             const unsigned char *start) {
    size_t f, at = 0;
    int    moved = 0, history = 0;
    for (f = 0; f < CLOTHI_FIELDS && moved >= 0; f++) {
        const clothi_field *q = clothi_fields + f;
        size_t              n = clothi_field_count(s, q) * q->size;
        double              still = 0;
        if (n == 0 || clothi_field_kind(q) != CLOTHI_MOTION) continue;
        if (q->at == offsetof(cloth_sim, history)) memcpy(&history, start + at, sizeof history);
        if (q->at == offsetof(cloth_sim, still)) memcpy(&still, start + at, sizeof still);
        n += CLOTHI_PAD8(n);
        if (memcmp(end + at, start + at, n) != 0) {
            if (!history && (q->at == offsetof(cloth_sim, history) ||
                             q->at == offsetof(cloth_sim, x_prev) ||
                             q->at == offsetof(cloth_sim, v_prev)))
                moved |= 1;
            else if (q->at == offsetof(cloth_sim, still) && !(still > 0)) moved |= 2;
            else moved = -1;
        }
        at += n;
    }
    return moved;
}

/* --- recording --- */

static void clothi_tape_end(cloth_tape *t, cloth_status status, const char *why) {
    t->ended = why;
    t->ended_by = status;
    clothi_say(&t->hooks, CLOTH_LOG_WARNING, status, "the tape ends after step %i: %s", t->n, why);
}

/* *block of at least `need` bytes. */
static int clothi_tape_room(cloth_tape *t, unsigned char **block, size_t size, size_t need) {
    unsigned char *more;
    if (*block && need <= size) return 1;
    more = (unsigned char *)clothi_tape_alloc(t, need, 1);
    if (!more) return 0;
    if (*block) memcpy(more, *block, size);
    clothi_tape_free(t, *block);
    *block = more;
    return 1;
}

/* The words in which `next` [size] differs from `input`, whose size is `before`; both stand in
 * blocks of zeros beyond. */
static int clothi_tape_words(cloth_tape *t, clothi_taped *e, size_t before) {
    const size_t    most = (e->size > before ? e->size : before) / 8;
    const size_t    hows = t->how && e->substeps > 0 ? (size_t)e->substeps : 0;
    const uint64_t *a = (const uint64_t *)(const void *)t->input;
    const uint64_t *b = (const uint64_t *)(const void *)t->next;
    uint32_t       *which;
    size_t          i, n = 0;
    for (i = 0; i < most; i++) n += a[i] != b[i];
    e->nword = n;
    e->word = (uint64_t *)clothi_tape_alloc(
        t, n * (sizeof(uint64_t) + sizeof(uint32_t)) + hows, 1);
    if (!e->word) return 0;
    which = (uint32_t *)(void *)(e->word + n);
    e->how = (unsigned char *)(which + n);
    if (hows) memcpy(which + n, t->how, hows);
    for (i = 0, n = 0; i < most; i++)
        if (a[i] != b[i]) {
            which[n] = (uint32_t)i;
            e->word[n++] = a[i] ^ b[i];
        }
    return 1;
}

static void clothi_tape_xor(const clothi_taped *e, unsigned char *input) {
    const uint32_t *which = (const uint32_t *)(const void *)(e->word + e->nword);
    uint64_t       *a = (uint64_t *)(void *)input;
    size_t          i;
    for (i = 0; i < e->nword; i++) a[which[i]] ^= e->word[i];
}

CLOTHI_RARE_BEGIN

/* Bytes that a budget must leave for a walk backwards: its vectors, two slots, a path; and for the
 * list of steps to grow. */
static size_t clothi_tape_reserve(const cloth_tape *t) {
    return t->work + 2 * t->slot + t->path + (2 * (size_t)t->capacity + 16) * sizeof *t->step +
           8 * CLOTHI_BLOCK;
}

typedef struct clothi_grad clothi_grad;     /* [4.2], [5.1] */
static size_t clothi_grad_arrays(const cloth_sim *s, size_t motion, size_t input, clothi_grad *g,
                                 unsigned char *block);

static size_t clothi_tape_work(const cloth_tape *t) {
    const cloth_desc *d = &t->sim->model->desc;
    size_t            work = clothi_grad_arrays(t->sim, t->motion, t->room, NULL, NULL);
    if (t->lags || (d->integrator != CLOTH_INTEGRATOR_LEAPFROG &&
                    (t->sim->contact_on || d->contact != CLOTH_CONTACT_NONE)))
        work += (2 * CLOTHI_GRAD_KRYLOV + 1) * t->nv3 * sizeof(double);
    return work;
}

/* The ends of the substeps but the last, behind the motion. */
static void clothi_tape_ends(const cloth_tape *t, unsigned char *slot) {
    const size_t each = t->nv3 * sizeof(double);
    if (t->slot > t->motion && t->traced > 1)
        memcpy(slot + t->motion, t->trace, (size_t)(t->traced - 1) * each);
}

/* Step k keeps its slot: the spacing wants it, or a step beside it cannot be run anew. */
static int clothi_tape_keeps(const cloth_tape *t, int k) {
    return k % t->spacing == 0 || t->step[k].cut || t->step[k - 1].cut;
}

/* The slot of step e, if it keeps one; every second slot goes until it fits. */
static int clothi_tape_slot(cloth_tape *t, int k) {
    clothi_taped *e = t->step + k;
    int           i;
    while (t->opt.bytes && t->spacing <= k &&
           t->bytes + t->slot + CLOTHI_BLOCK + clothi_tape_reserve(t) > t->opt.bytes) {
        t->spacing *= 2;
        for (i = 0; i < k; i++)
            if (t->step[i].slot && !clothi_tape_keeps(t, i)) {
                clothi_tape_free(t, t->step[i].slot);
                t->step[i].slot = NULL;
            }
    }
    if (!clothi_tape_keeps(t, k)) return 1;
    e->slot = (unsigned char *)clothi_tape_alloc(t, t->slot, 1);
    if (!e->slot) return 0;
    memcpy(e->slot, t->start, t->motion);
    clothi_tape_ends(t, e->slot);
    return 1;
}

/* The input of the step whose record this is, into next [e->size]; motion into start. */
static int clothi_tape_take(cloth_tape *t, const cloth_step_record *r, clothi_taped *e) {
    cloth_sim   *s = t->sim;
    const size_t fields = clothi_walked(s, CLOTHI_SIZE, NULL, CLOTHI_PARAM, 0);
    size_t       at;
    e->units = r->bytes - fields;
    e->size = t->fixed_input + e->units;
    e->size += CLOTHI_PAD8(e->size);
    if (e->size > t->room) {
        const size_t more = e->size + (e->size - t->fixed_input);
        if (!clothi_tape_room(t, &t->input, t->room, more)) return 0;
        if (!clothi_tape_room(t, &t->next, t->room, more)) return 0;
        t->room = more;
        t->work = clothi_tape_work(t);
    }
    memset(t->next, 0, t->room);
    at = clothi_tape_split(s, r->state, t->start, t->next);
    (void)clothi_tape_walk(s, CLOTHI_PARAMS, CLOTHI_SAVE, t->next + t->fixed_input - t->params);
    memcpy(t->next + t->fixed_input, (const unsigned char *)r->state + at, r->bytes - at);
    return 1;
}

static int clothi_all_zero(const double *a, size_t n) {
    size_t i;
    for (i = 0; i < n; i++)
        if (fabs(a[i]) > 0) return 0;
    return 1;
}

static int clothi_tape_grow(cloth_tape *t) {
    const size_t   old = (size_t)t->capacity;
    unsigned char *block = (unsigned char *)t->step;
    if (t->n < t->capacity) return 1;
    if (!clothi_tape_room(t, &block, old * sizeof *t->step, (2 * old + 16) * sizeof *t->step))
        return 0;
    t->step = (clothi_taped *)(void *)block;
    t->capacity = 2 * t->capacity + 16;
    return 1;
}

/* Doubles of LEAPFROG's path a kick: x and v; with contact, those that it is given too. */
static size_t clothi_tape_each(const cloth_tape *t) {
    return (t->sim->contact_on ? 4 : 2) * t->nv3;
}

/* A step was accepted; r NULL: what it would have begun with was moved. */
static void clothi_tape_step(void *user, const cloth_step_record *r) {
    cloth_tape    *t = (cloth_tape *)user;
    cloth_recorder *host = &t->sim->host;
    clothi_taped  *e;
    const size_t   before = t->n ? t->step[t->n - 1].size : 0;
    unsigned char *swap;
    int            moved = 0;
    if (!r) {
        if (t->n && !t->ended)
            clothi_tape_end(t, CLOTH_ERR_ARGUMENT, "a term or an obstacle was added, or an "
                            "obstacle removed or teleported");
        return;
    }
    if (t->mode == CLOTHI_TAPE_RECORD && host->step) host->step(host->user, r);
    if (t->mode != CLOTHI_TAPE_RECORD || t->ended) return;
    if (t->lost || !clothi_tape_grow(t) || !clothi_tape_take(t, r, t->step + t->n)) {
        clothi_tape_end(t, CLOTH_ERR_MEMORY, "no memory");
        return;
    }
    e = t->step + t->n;
    e->h = r->h, e->fraction = t->sim->taken;
    if (!(r->h > 0) && clothi_static_lags(t->sim)) t->lags = 1, t->work = clothi_tape_work(t);
    e->asleep = r->outcome == CLOTH_STEP_ASLEEP;
    e->slept = !e->asleep && r->h > 0 && t->sim->model->desc.sleep > 0 &&
               t->sim->still >= t->sim->model->desc.sleep;
    e->substeps = e->asleep ? 0 : t->traced;
    e->cut = t->how && t->sim->finish;      /* LEAPFROG goes on */
    e->inexact = t->sim->contact_on && r->outcome == CLOTH_STEP_MAX_ITERATIONS;
    if (t->how && e->substeps > 0 && t->sim->history) t->how[e->substeps - 1] |= CLOTHI_HOW_KEPT;
    if (t->sim->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG)
        t->path = clothi_max_size(t->path, (size_t)(e->substeps + 1) * clothi_tape_each(t) *
                                               sizeof(double));
    if (t->n) moved = clothi_tape_moved(t->sim, t->end, t->start);
    if (moved < 0) {
        clothi_tape_end(t, CLOTH_ERR_ARGUMENT, "the state was moved by something else than a step "
                        "(a write, restore, reset, replay or teleport)");
        return;
    }
    e->dropped = moved;
    e->params = !t->n || memcmp(t->next + t->fixed_input - t->params,
                                t->input + t->fixed_input - t->params, t->params) != 0;
    if (!clothi_tape_words(t, e, before) || !clothi_tape_slot(t, t->n)) {
        clothi_tape_free(t, e->word);
        clothi_tape_end(t, CLOTH_ERR_MEMORY, "no memory");
        return;
    }
    if (t->opt.bytes && t->bytes + clothi_tape_reserve(t) > t->opt.bytes) {
        clothi_tape_free(t, e->word);
        clothi_tape_free(t, e->slot);
        clothi_tape_end(t, CLOTH_ERR_CAPACITY, "options.bytes leave no room for one more step");
        return;
    }
    swap = t->input, t->input = t->next, t->next = swap;
    (void)clothi_tape_walk(t->sim, CLOTHI_MOTION, CLOTHI_SAVE, t->end);
    t->n++;
}

/* A trace of at least `need` doubles, those of a step at once; what was in it is gone. */
static int clothi_tape_trace(cloth_tape *t, size_t need) {
    const size_t step = (t->slot - t->motion) / sizeof(double) + t->nv3;
    if (need <= t->trace_room) return 1;
    if (need < step) need = step;
    clothi_tape_free(t, t->trace);
    t->trace = (double *)clothi_tape_alloc(t, need, sizeof(double));
    t->trace_room = t->trace ? need : 0;
    return t->trace != NULL;
}

/* A substep ends: its x; of LEAPFROG, when it is asked for, x and v at each kick. */
static void clothi_tape_substep(void *user, const cloth_step_input *in, const double *x) {
    cloth_tape  *t = (cloth_tape *)user;
    cloth_recorder *host = &t->sim->host;
    const int    leap = in->y == NULL && in->h > 0;
    const size_t each = leap ? clothi_tape_each(t) : t->nv3;
    size_t       need;
    t->sim->landing = NULL;
    if (t->mode == CLOTHI_TAPE_RECORD && host->substep) host->substep(host->user, in, x);
    if (t->mode == CLOTHI_TAPE_DEAF || (t->mode == CLOTHI_TAPE_RECORD && t->ended)) return;
    if (!(in->share[0] > 0)) t->traced = 0, t->lost = 0;
    if (t->how) {
        if (t->traced && in->x_prev) t->how[t->traced - 1] |= CLOTHI_HOW_KEPT;
        t->how[t->traced] = (unsigned char)((in->eta < 0.9 * in->h ? 0 : CLOTHI_HOW_EULER) |
                                            (in->squeezed ? CLOTHI_HOW_SQUEEZED : 0));
    }
    need = (size_t)(t->traced + 1) * each;
    if (leap ? t->mode == CLOTHI_TAPE_RECORD : t->slot == t->motion) need = 0;      /* counted */
    if (need && !clothi_tape_trace(t, need)) t->lost = 1;
    if (need && !t->lost) {
        double *to = t->trace + (size_t)t->traced * each;
        memcpy(to, x, t->nv3 * sizeof(double));
        if (leap) memcpy(to + t->nv3, in->v, t->nv3 * sizeof(double));
        if (leap && t->sim->contact_on) t->sim->landing = to + 2 * t->nv3;
    }
    t->traced++;
}

static void clothi_tape_orphan(void *user) {
    cloth_tape *t = (cloth_tape *)user;
    t->sim = NULL;
    t->ended = "the sim is destroyed";
}

/* --- create and destroy --- */

CLOTH_API cloth_tape_options cloth_tape_options_default(void) {
    cloth_tape_options o;
    memset(&o, 0, sizeof o);
    o.cookie = CLOTHI_TAPE_COOKIE;
    o.linear = CLOTH_LINEAR_AUTO;
    o.tolerance = CLOTH_DEFAULT_ADJOINT_TOLERANCE;
    o.early = CLOTH_DEFAULT_EARLY;
    return o;
}

static cloth_status clothi_tape_check(const cloth_hooks *hooks, const cloth_tape_options *o) {
    if (o->cookie != CLOTHI_TAPE_COOKIE)
        return clothi_fail(hooks, CLOTH_ERR_UNINIT, "cloth_tape_options: start from "
                           "cloth_tape_options_default()");
    if (!clothi_finite(o->tolerance) || !clothi_finite(o->early))
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "cloth_tape_options: tolerance = %g, "
                           "early = %g must be finite", o->tolerance, o->early);
    if (!(o->tolerance > 0) || o->tolerance > 0.1 || o->early < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_tape_options: tolerance = %g must be "
                           "in (0, 0.1], early = %g at least 0", o->tolerance, o->early);
    if (o->linear < CLOTH_LINEAR_AUTO || o->linear > CLOTH_LINEAR_CHOLESKY)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_tape_options: linear = %i is no "
                           "cloth_linear", (int)o->linear);
    return CLOTH_OK;
}

/* Sizes and the arrays that every tape has. */
static cloth_status clothi_tape_arrays(cloth_tape *t) {
    cloth_sim *s = t->sim;
    const int    leap = s->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG;
    const size_t how = leap ? 0 : (size_t)clothi_substeps(s, 1);
    size_t     need, units = clothi_tape_units(s, CLOTHI_SIZE, NULL, 0);
    t->nv3 = 3 * (size_t)s->model->nv;
    t->motion = clothi_tape_walk(s, CLOTHI_MOTION, CLOTHI_SIZE, NULL);
    t->params = clothi_tape_walk(s, CLOTHI_PARAMS, CLOTHI_SIZE, NULL);
    t->fixed_input = clothi_tape_walk(s, CLOTHI_INPUTS, CLOTHI_SIZE, NULL) + t->params;
    t->slot = t->motion;
    if (!leap) t->slot += (how - 1) * t->nv3 * sizeof(double);
    else t->path = (size_t)(s->model->desc.substeps + 1) * clothi_tape_each(t) * sizeof(double);
    t->room = t->fixed_input + units + CLOTHI_PAD8(units);
    t->work = clothi_tape_work(t);
    (void)clothi_tape_grow(t);              /* t->step: see below */
    need = t->bytes + 2 * (t->motion + t->room) + clothi_tape_reserve(t) + 2 * t->slot + 2 * how +
           (t->room / 8) * 12 + 8 * CLOTHI_BLOCK;
    if (t->opt.bytes && t->opt.bytes < need)
        return clothi_fail(&t->hooks, CLOTH_ERR_CAPACITY, "cloth_tape_create: options.bytes = %z "
                           "but one step takes %z", t->opt.bytes, need);
    t->start = (unsigned char *)clothi_tape_alloc(t, t->motion, 1);
    t->end = (unsigned char *)clothi_tape_alloc(t, t->motion, 1);
    t->input = (unsigned char *)clothi_tape_alloc(t, t->room, 1);
    t->next = (unsigned char *)clothi_tape_alloc(t, t->room, 1);
    if (how) t->how = (unsigned char *)clothi_tape_alloc(t, how, 1);
    if (t->step && t->start && t->end && t->input && t->next && (t->how || leap)) return CLOTH_OK;
    return CLOTH_ERR_MEMORY;
}

CLOTH_API cloth_status cloth_tape_create(cloth_sim *sim, const cloth_tape_options *opt,
                                         cloth_tape **out) {
    cloth_tape_options o = opt ? *opt : cloth_tape_options_default();
    cloth_tape        *t;
    cloth_status       status;
    if (out) *out = NULL;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!out) return clothi_null(&sim->hooks, "cloth_tape_create: out");
    status = clothi_tape_check(&sim->hooks, &o);
    if (status) return status;
    if (sim->tape_gone)
        return clothi_fail(&sim->hooks, CLOTH_ERR_ARGUMENT, "cloth_tape_create: this sim has a "
                           "tape already");
    t = (cloth_tape *)clothi_alloc(&sim->model->hooks, 1, sizeof *t);
    if (!t) return CLOTH_ERR_MEMORY;
    t->hooks = sim->model->hooks;
    t->opt = o;
    t->spacing = 1;
    t->bytes = t->most = clothi_block_size(t);
    t->sim = sim;
    status = clothi_tape_arrays(t);
    if (status) {
        t->sim = NULL;
        cloth_tape_destroy(t);
        return status;
    }
    sim->host = sim->recorder;
    sim->recorder.user = t;
    sim->recorder.substep = clothi_tape_substep;
    sim->recorder.step = clothi_tape_step;
    sim->tape_gone = clothi_tape_orphan;
    *out = t;
    return CLOTH_OK;
}

CLOTH_API void cloth_tape_destroy(cloth_tape *tape) {
    int k;
    if (!tape) return;
    if (tape->sim) {
        tape->sim->recorder = tape->sim->host;
        tape->sim->tape_gone = NULL;
    }
    for (k = 0; k < tape->n; k++) {
        clothi_tape_free(tape, tape->step[k].word);
        clothi_tape_free(tape, tape->step[k].slot);
    }
    {
        const void *const rest[] = {tape->step, tape->start, tape->end, tape->input, tape->next,
                                    tape->trace, tape->how, tape};
        (void)clothi_blocks(&tape->hooks, rest, sizeof rest / sizeof *rest);
    }
}

CLOTH_API int cloth_tape_steps(const cloth_tape *tape) { return tape ? tape->n : 0; }

CLOTH_API size_t cloth_tape_bytes(const cloth_tape *tape, size_t *most) {
    if (most) *most = tape ? tape->most : 0;
    return tape ? tape->bytes : 0;
}

CLOTH_API const char *cloth_tape_ended(const cloth_tape *tape) {
    return tape ? tape->ended : NULL;
}

CLOTHI_RARE_END

/* ===== [4.1] A SUBSTEP, LINEARISED ===========================================================
 *
 *   x: free axes       M (x - y)/eta^2 + dE/dx = 0
 *      pinned axes     x = x0 + share (target - x0),   x0 at the start of the step
 *      followers       x = x_leader + constant         x = T (leaders) + constant
 *   y = yx x^n + yv v^n + yp x^(n-1) + yw v^(n-1)      (free axes and followers)
 *   v = vx x + vn x^n + vp x^(n-1)
 *
 *             yx    yv    yp    yw         vx       vn     vp       eta
 *   Euler     1     h     0     0          1/h    -1/h    0         h
 *   BDF2      4/3   8h/9  -1/3  -2h/9      3/(2h) -2/h    1/(2h)    2h/3
 *   statics   0     0     0     0          0       0      0         infinite
 *
 * H is the exact Hessian at the accepted x, T' H T with ties, as clothsim.h [9.2] assembles it.
 * The sim is put where the substep began, its terms begin (what they lag is derived from there),
 * and w.x holds the accepted x: the sim is then as it was when the minimiser had just ended.
 */

typedef struct clothi_line {                /* a substep, linearised                           */
    clothi_goal goal;
    double      h, weight;                  /* s; 1/eta^2                                      */
    int         bdf2, kept;                 /* kept: there is a history after it               */
    double      yx, yv, yp, yw, vx, vn, vp;
} clothi_line;

static void clothi_line_weights(clothi_line *q, int kept) {
    const double h = q->h;
    const int    second = q->bdf2 && kept;
    q->yx = q->yv = q->yp = q->yw = q->vx = q->vn = q->vp = 0;
    q->kept = kept;
    if (!(h > 0)) return;
    q->yx = q->bdf2 ? 4.0 / 3 : 1;
    q->yv = q->bdf2 ? 8 * h / 9 : h;
    q->yp = q->bdf2 ? -1.0 / 3 : 0;
    q->yw = q->bdf2 ? -2 * h / 9 : 0;
    q->vx = second ? 1.5 / h : 1 / h;
    q->vn = second ? -2 / h : -1 / h;
    q->vp = second ? 0.5 / h : 0;
}

/* Contact is told that x, which w.x holds, is a minimiser: its pairs, frames and normal forces are
 * those of x, and nothing of it lags. */
static cloth_status clothi_line_contact(cloth_sim *s) {
    int          done = 1;
    cloth_status status = s->contact.update(s->contact.user, s->w.x, NULL, NULL);
    memset(s->w.rhs, 0, 3 * (size_t)s->model->nv * sizeof(double));
    return status ? status : s->contact.update(s->contact.user, s->w.x, s->w.rhs, &done);
}

/* Substep j of m of the taped step e from the sim's state on, which ended at x. */
static cloth_status clothi_line_open(cloth_sim *s, const clothi_taped *e, int j, int m,
                                     const double *x, clothi_line *q) {
    const double h = e->h;
    const int    how = h > 0 && e->how ? e->how[j] : (int)CLOTHI_HOW_KEPT;
    const int    kept = (how & CLOTHI_HOW_KEPT) != 0;
    cloth_status status;
    int          i;
    memset(q, 0, sizeof *q);
    q->h = h / m;
    if (!(h > 0)) {                         /* x^n of what lags is where the search ended */
        memcpy(s->state.x, x, 3 * (size_t)s->model->nv * sizeof(double));
        memset(s->state.v, 0, 3 * (size_t)s->model->nv * sizeof(double));
    }
    clothi_input(s, q->h, (double)j / m, (double)(j + 1) / m);
    clothi_eval_start(s, &q->goal, q->h);
    s->in.squeezed = how & CLOTHI_HOW_SQUEEZED;
    if (h > 0) {
        q->bdf2 = clothi_predict(s, q->h, &q->goal.eta);
        if (how & CLOTHI_HOW_EULER) {       /* contact took the guess of BDF2 for an impact */
            q->goal.eta = q->h, q->bdf2 = 0;
            for (i = 0; i < 3 * s->model->nv; i++) s->w.y[i] = clothi_predicted(s, q->h, 0, i);
        }
        s->in.eta = q->goal.eta;
        s->in.y = s->w.y;
        q->weight = 1 / (q->goal.eta * q->goal.eta);
    } else memcpy(s->w.y, x, 3 * (size_t)s->model->nv * sizeof(double));
    clothi_line_weights(q, kept);
    clothi_guess(s, q->h);                  /* w.y of what is pinned */
    status = clothi_terms_begin(s, &q->goal);
    memcpy(s->w.x, x, 3 * (size_t)s->model->nv * sizeof(double));
    q->goal.e.x = s->w.x;
    return status || !s->contact_on ? status : clothi_line_contact(s);
}

/* The sim goes on to the end of that substep, as the step did. */
static cloth_status clothi_line_close(cloth_sim *s, const clothi_line *q) {
    int          impact = 0;
    cloth_status status = CLOTH_OK;
    if (s->contact_on) status = s->contact.close(s->contact.user, s->w.x, &impact);
    clothi_advance(s, q->h, q->bdf2, q->kept);
    return status;
}

/* ===== [4.2] ITS ADJOINT =====================================================================
 *
 *   given  lx lv lp lw   dL/d{x, v, x^(n-1), v^(n-1)} after the substep
 *   find   nx nv np nw   the same before it, and what goes to the parameters
 *
 *   a  = lx + vx lv                                  all that x moves
 *   T' H T z = T' a over the free leaders, z = 0 on pins; then z <- T z
 *   dL/dy     =  weight M z                          to nx nv np nw by the weights of y
 *   dL/dm     = -weight z (x - y)
 *   dL/dp     = -z' d(grad E)/dp                     the terms' vjp of -z: x^n and v^n among p
 *   dL/dgoal  =  T'(a - H z) on pinned axes          to the target by share, else to x0
 *   nx += vn lv + lp,   np += vp lv,   nw += 0,   nv += lw
 *
 * Why -z' d(grad)/dp. H dx = -d(grad)/dp dp on free axes, so a.dx = a' H^-1 (-d(grad)/dp dp) =
 * -z' d(grad)/dp dp, H being symmetric. On pinned axes dx = dgoal is given: a.dgoal directly, and
 * through H's columns, -z' H dgoal.
 *
 * Statics: M/eta^2 = 0 and x^n does not matter. Wind, and what hosts' terms lag, is lagged to x
 * itself: grad E(x, x^n = x) = 0, whose Jacobian is J = H + W, W = d(grad)/dx^n, not symmetric:
 * J'z = a as with contact. (H z <- a - W'z, as the forward search goes, need not converge.)
 *
 * Attachments pull to pose + share (target - pose); the pose is where the last step took
 * it, or the point itself where it was attached since; at the tape's start it is a constant.
 *
 * Contact's vjp gives J'z alone for J = dF/dx, F its forces with all that Newton's search lags
 * taken at x, where it has arrived. J'z = a by GCR [EES83] with the factor of H,
 * contact's definite model in it; J - H is small: 3 to 10 directions. What anchors carry to the
 * next substep depends on x too and joins a.
 *
 * What an early stop costs. With g = grad phi left at x the minimum is at x + d, H d = -g. There H
 * z = a has another H: z is off by about H^-1 (H(x + d) - H(x)) z, relative to a by |(H(x + d) -
 * H(x)) z|/|a|. One more right-hand side for the factor and two products H u; summed over the
 * steps in report.early. First order, of elements and contact; where contact lets x go a part of d
 * alone, of that part and over it.
 * checked: tests/test_grad.c: differences_*, tests/test_grad_contact.c, tests/stability/grad_flag.c
 */

struct clothi_grad {                        /* one walk backwards                              */
    cloth_tape        *t;
    cloth_sim         *s;
    const cloth_grad  *out;
    cloth_grad_report *rep;
    cloth_loss_fn     *loss;
    void              *user;
    unsigned char *input;                   /* [t->room] that of step `at`                     */
    int            at;                      /* -1: zeros                                       */
    unsigned char *kept_motion, *kept_input;/* the sim as it was                               */
    unsigned char *here;                    /* a slot                                          */
    double *x, *v;                          /* [nv x 3] after the step under way               */
    double *lx, *lv, *lp, *lw;              /* [nv x 3] adjoint after the substep under way    */
    double *nx, *nv, *np, *nw;              /* before it, one behind the other as those        */
    double *x0;                             /* of x at the step's start, by goals              */
    double *gx, *gv;                        /* what the loss says, likewise                    */
    double *a, *z, *q, *left;               /* [nv x 3] scratch                                */
    int     paired;                         /* w.dx holds what Newton's method would add       */
    int     forwards;                       /* the tangent                                     */
    double *mass;                           /* [nv]                                            */
    double *sum[2];                         /* [nbatch x (nrest + 1) x 8] of stretch, bending: by
                                               the numbers of rest, by tau, under these params */
    double *mu, *lambda, *bending, *damping;/* [nregions] under the params of the sim          */
    double *pose, *aim;                     /* [max_attachments x 3] by where attachments are at
                                               a step's start, by where it takes them          */
    cloth_pattern *pattern;                 /* LEAPFROG with hosts' terms: of no element       */
    cloth_matrix *elastic;                  /* with contact: H without it; LEAPFROG: hosts' H  */
    double *krylov;                         /* [2 CLOTHI_GRAD_KRYLOV + 1][nv x 3]              */
    cloth_contact_grad touch;               /* what contact has results for                    */
};

#define CLOTHI_GRAD_ARRAYS 17               /* [nv x 3] of the above                           */

static void clothi_grad_doubt(clothi_grad *g, unsigned doubt, int k) {
    if (!g->rep->doubt || k < g->rep->step) g->rep->step = k;
    g->rep->doubt |= doubt;
}

static cloth_linear clothi_grad_method(const clothi_grad *g) {
    return g->t->opt.linear == CLOTH_LINEAR_AUTO ? CLOTH_LINEAR_CHOLESKY : g->t->opt.linear;
}

/* One more right-hand side b for the matrix of the last solve: its factor is still there, and gives
 * the answer where it is not definite. */
static cloth_status clothi_grad_again(clothi_grad *g, const double *b, double tolerance,
                                      double *x) {
    cloth_sim           *s = g->s;
    cloth_linear_options opt = cloth_linear_options_default();
    clothi_cg            cg;
    cloth_status         status;
    opt.method = clothi_grad_method(g);
    opt.tolerance = tolerance;
    opt.fixed = s->fixed;
    if (opt.method != CLOTH_LINEAR_CHOLESKY)
        return cloth_linear_solve(s->solver, s->matrix, b, x, &opt, NULL);
    status = clothi_linear_begin(s->solver, s->matrix, b, x, &opt, &cg);
    if (!status) status = clothi_plain_cg(s->solver, clothi_by_factor, &cg);
    g->rep->iterations += cg.it;
    return status == CLOTH_ERR_NUMERIC ? cloth_factor_solve(s->solver->factor, b, x) : status;
}

/* r = b - A x over the free unknowns; returns |r|/|b|. Ax [nv x 3]: all rows of it. */
static double clothi_grad_residual(const cloth_sim *s, const double *b, const double *x, double *Ax,
                                   double *r) {
    double sum = 0, size = 0;
    int    i;
    cloth_matrix_mul(s->matrix, NULL, x, Ax);
    for (i = 0; i < 3 * s->model->nv; i++) {
        r[i] = s->fixed[i / 3] >> i % 3 & 1 ? 0 : b[i] - Ax[i];
        sum += r[i] * r[i];
        if (!(s->fixed[i / 3] >> i % 3 & 1)) size += b[i] * b[i];
    }
    return size > 0 ? sqrt(sum / size) : 0;
}

#define CLOTHI_GRAD_REFINE 30               /* rounds for a matrix that is not definite        */

/* Rows [0, n) of x -= L r, of three columns of L, `ld` apart. */
CLOTHI_HOT void clothi_pair_take(const double *CLOTHI_RESTRICT L, size_t ld, int n, const double *r,
                                 double *CLOTHI_RESTRICT x) {
    const double *CLOTHI_RESTRICT M = L + ld, *CLOTHI_RESTRICT N = M + ld;
    const double  r0 = r[0], r1 = r[1], r2 = r[2];
    int           i;
    for (i = 0; i < n; i++) x[i] -= L[i] * r0 + M[i] * r1 + N[i] * r2;
}

/* r -= L'x, likewise. */
CLOTHI_HOT void clothi_pair_sum(const double *CLOTHI_RESTRICT L, size_t ld, int n,
                                const double *CLOTHI_RESTRICT x, double *r) {
    enum { W = 4 };
    const double *CLOTHI_RESTRICT M = L + ld, *CLOTHI_RESTRICT N = M + ld;
    double a[W] = {0}, b[W] = {0}, c[W] = {0};
    int    i, k;
    for (i = 0; i + W <= n; i += W)
        for (k = 0; k < W; k++)
            a[k] += L[i + k] * x[i + k], b[k] += M[i + k] * x[i + k], c[k] += N[i + k] * x[i + k];
    for (; i < n; i++) a[0] += L[i] * x[i], b[0] += M[i] * x[i], c[0] += N[i] * x[i];
    r[0] -= (a[0] + a[1]) + (a[2] + a[3]);
    r[1] -= (b[0] + b[1]) + (b[2] + b[3]);
    r[2] -= (c[0] + c[1]) + (c[2] + c[3]);
}

/* b [2] := (L S L')^-1 of them, by elimination number; t [2]: a boundary each. Three columns at a
 * time, for one vector after the other: what is loaded of L is used twice, what is stored goes down
 * by three. */
static void clothi_pair_solve(const cloth_factor *f, double *const *b, double *const *t) {
    const int nparts = f->p->nparts;
    int       q, i, k, h, back;
    for (back = 0; back < 2; back++) {
        for (i = 0; back && i < 6 * f->p->n; i++) b[i & 1][i / 2] *= f->pivot[i / 2];
        for (q = back ? nparts - 1 : 0; q >= 0 && q < nparts; q += back ? -1 : 1) {
            const clothi_front *w = f->front + q;
            const int     n = w->n, nb = w->nb, *bound = nb ? f->bound + w->bound : NULL;
            const size_t  ld = (size_t)(n + nb);
            for (i = 0; i < 2 * nb; i++)
                t[i & 1][i / 2] = back ? b[i & 1][3 * bound[i / 6] + i / 2 % 3] : 0;
            for (i = 0; i < n / 3 * 2; i++) {
                const int     j = back ? n - 3 - i / 2 * 3 : i / 2 * 3;
                const double *l = f->panel + w->panel + (size_t)j * (ld + 1), *edge = l + (n - j);
                double       *x = b[i & 1] + 3 * (size_t)w->mid + j;
                if (back) {
                    clothi_pair_sum(edge, ld, nb, t[i & 1], x);
                    clothi_pair_sum(l + 3, ld, n - j - 3, x + 3, x);
                }
                for (k = back ? 2 : 0; k >= 0 && k < 3; k += back ? -1 : 1) {
                    if (!back) x[k] /= l[(size_t)k * (ld + 1)];
                    for (h = k + 1; h < 3; h++)
                        x[back ? k : h] -= l[(size_t)k * ld + (size_t)h] * x[back ? h : k];
                    if (back) x[k] /= l[(size_t)k * (ld + 1)];
                }
                if (back) continue;
                clothi_pair_take(l + 3, ld, n - j - 3, x, x + 3);
                clothi_pair_take(edge, ld, nb, x, t[i & 1]);
            }
            for (i = 0; i < 2 * nb && !back; i++)
                b[i & 1][3 * bound[i / 6] + i / 2 % 3] += t[i & 1][i / 2];
        }
    }
}

/* x [2] = H^-1 b [2] with the factor; g->nv and g->np are scratch. */
static void clothi_grad_pair(clothi_grad *g, const double *const *b, double *const *x) {
    cloth_factor *f = g->s->solver->factor;
    const int     n = (int)g->t->nv3;
    double       *to[2], *edge[2];
    int           i, k;
    to[0] = g->nv, to[1] = g->np, edge[0] = f->vec, edge[1] = f->vec + n;
    for (i = 0; i < 2 * n; i++) {
        k = i / 2;
        to[i & 1][k] = f->pivot[k] && !(f->fixed[k / 3] >> k % 3 & 1)
                           ? b[i & 1][3 * f->p->verts[k / 3] + k % 3] : 0;
    }
    clothi_pair_solve(f, to, edge);
    for (i = 0; i < 2 * n; i++) x[i & 1][3 * f->p->verts[i / 6] + i / 2 % 3] = to[i & 1][i / 2];
}

/* A x = b to a residual *r, corrected until it is small enough. CHOLESKY: with the factor L S L',
 * good also where pivots are negative; what lies outside the pattern (attachments, ties) is not in
 * it: then it preconditions CG, or, at negative pivots, the residual says whether corrections came
 * to an end. Else the kit's CG. */
static cloth_status clothi_grad_refine(clothi_grad *g, cloth_linear method, const double *b,
                                       double *x, int *negative, double *r) {
    const double tolerance = g->t->opt.tolerance;
    const int    direct = method == CLOTH_LINEAR_CHOLESKY;
    cloth_sim   *s = g->s;
    cloth_linear_options opt = cloth_linear_options_default();
    cloth_linear_report  lr;
    cloth_status status = CLOTH_OK;
    double       last = HUGE_VAL;
    const double *from[2];
    double      *to[2];
    size_t       i, bytes = g->t->nv3 * sizeof(double);
    int          k;
    from[0] = g->left, from[1] = s->w.rhs, to[0] = g->q, to[1] = s->w.dx;
    if (direct) status = clothi_solver_factor(s->solver, s->matrix, s->fixed);
    g->rep->factorizations += direct;
    *negative = status == CLOTH_ERR_NUMERIC;
    if (status && !*negative) return status;
    memcpy(g->left, b, bytes);
    memset(x, 0, bytes);
    g->paired = direct && g->t->opt.early > 0 && s->matrix->ne == 0;
    opt.method = method, opt.fixed = s->fixed, opt.tolerance = tolerance;
    for (k = 0, status = CLOTH_OK; k < CLOTHI_GRAD_REFINE; k++) {
        memset(g->q, 0, bytes);
        if (k == 0 && g->paired) clothi_grad_pair(g, from, to);
        else if (direct) status = cloth_factor_solve(s->solver->factor, g->left, g->q);
        else {
            status = cloth_linear_solve(s->solver, s->matrix, g->left, g->q, &opt, &lr);
            g->rep->iterations += lr.iterations;
            *negative |= lr.negative;
        }
        if (status) return status;
        for (i = 0; i < g->t->nv3; i++) x[i] += g->q[i];
        *r = clothi_grad_residual(s, b, x, g->q, g->left);
        if (*r <= tolerance) return CLOTH_OK;
        if (!(*r < 0.1 * last) && (!*negative || !(*r < 0.9 * last))) break;
        last = *r;
        opt.tolerance = 0.5 * tolerance / last;
    }
    if (*negative || !direct) return CLOTH_OK;
    status = clothi_grad_again(g, b, 0.1 * tolerance, x);
    *r = clothi_grad_residual(s, b, x, g->q, g->left);
    return status;
}

/* --- with contact --- */

#define CLOTHI_GRAD_TURNS 6

/* out = J' z over all rows, J = dF/dx of all terms and contact, or in statics of what is lagged;
 * forwards J z. */
static cloth_status clothi_grad_apply(clothi_grad *g, const cloth_eval *e, const double *z,
                                      double *out) {
    cloth_sim    *s = g->s;
    const size_t  bytes = g->t->nv3 * sizeof(double);
    cloth_vjp     to;
    cloth_status  status = CLOTH_OK;
    size_t        i;
    int           k;
    memset(&to, 0, sizeof to);
    *(s->contact_on ? &to.x : &to.x_n) = g->nv;
    memcpy(g->nx, z, bytes);
    memset(g->nv, 0, bytes);
    clothi_tie_spread(s->model, g->nx);
    for (k = CLOTHI_TERM_WIND; !s->contact_on && k < s->nterms && !status; k++)
        status = s->term[k].vjp(s->term[k].user, e, g->nx, &to);
    if (s->contact_on)
        status = g->forwards ? s->contact.jvp(s->contact.user, e, NULL, g->nx, g->nv)
                             : s->contact.vjp(s->contact.user, e, g->nx, &to);
    clothi_tie_gradient(s->model, g->nv);
    cloth_matrix_mul(s->contact_on ? g->elastic : s->matrix, NULL, z, out);
    for (i = 0; i < g->t->nv3; i++) out[i] += g->nv[i];
    return status;
}

/* The factor of the matrix, with contact's model; then H without contact into g->elastic. */
static cloth_status clothi_grad_matrices(clothi_grad *g, clothi_line *line, int *negative) {
    cloth_sim    *s = g->s;
    cloth_matrix *with = s->matrix;
    cloth_status  status = clothi_solver_factor(s->solver, with, s->fixed);
    g->rep->factorizations++;
    *negative = status == CLOTH_ERR_NUMERIC;
    if (!s->contact_on && *negative) return CLOTH_OK;
    if (!s->contact_on || (status && !*negative)) return status;
    s->matrix = g->elastic;
    s->contact_on = 0;
    status = clothi_newton_assemble(s, &line->goal, 1);
    s->contact_on = 1;
    s->matrix = with;
    return status;
}

static double clothi_grad_dot(const double *a, const double *b, size_t n) {
    double sum = 0;
    size_t i;
    for (i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* a of what is pinned = 0. */
static void clothi_grad_free(const clothi_grad *g, double *a) {
    size_t i;
    for (i = 0; i < g->t->nv3; i++)
        if (g->s->fixed[i / 3] >> i % 3 & 1) a[i] = 0;
}

/* r = b - J' z on free axes; returns its length. */
static double clothi_grad_left(const clothi_grad *g, const double *b, const double *Jz, double *r) {
    size_t i;
    for (i = 0; i < g->t->nv3; i++) r[i] = b[i] - Jz[i];
    clothi_grad_free(g, r);
    return sqrt(clothi_grad_dot(r, r, g->t->nv3));
}

/* Direction `it` of GCR [EES83] from z on; g->krylov has the residual, of length *left, then the
 * others, each with what J' makes of it. Preconditioned by the model of H with contact: by its
 * factor, or, where it has entries outside the pattern, by CG with that. */
static cloth_status clothi_grad_gcr(clothi_grad *g, const cloth_eval *e, int it, double *z,
                                    double *left) {
    const size_t n = g->t->nv3;
    double      *r = g->krylov, *p = r + n + 2 * n * (size_t)it, *q = p + n, *o, size, along;
    cloth_status status = g->s->matrix->ne ? clothi_grad_again(g, r, 1e-2, p)
                                           : cloth_factor_solve(g->s->solver->factor, r, p);
    size_t       l;
    clothi_grad_free(g, p);
    if (!status) status = clothi_grad_apply(g, e, p, q);
    if (status) return status;
    g->rep->iterations++;
    clothi_grad_free(g, q);
    for (o = r + n; o < p; o += 2 * n) {
        along = clothi_grad_dot(o + n, q, n);
        for (l = 0; l < n; l++) p[l] -= along * o[l], q[l] -= along * o[n + l];
    }
    size = sqrt(clothi_grad_dot(q, q, n));
    along = size > 0 ? clothi_grad_dot(q, r, n) / size : 0;
    for (l = 0; l < n && size > 0; l++) {
        p[l] /= size, q[l] /= size;
        z[l] += along * p[l], r[l] -= along * q[l];
    }
    *left = sqrt(clothi_grad_dot(r, r, n));
    return CLOTH_OK;
}

/* J' z = b over the free leaders to a residual *r, J not symmetric; g->q = J' z, all rows. */
static cloth_status clothi_grad_touching(clothi_grad *g, clothi_line *line, const double *b,
                                         double *z, int *negative, double *r) {
    const size_t n = g->t->nv3;
    const double most = g->t->opt.tolerance;
    double       size, left;
    int          it, turn;
    cloth_status status = clothi_grad_matrices(g, line, negative);
    memset(z, 0, n * sizeof(double));
    memset(g->q, 0, n * sizeof(double));
    line->goal.e.x = g->s->w.x;
    size = left = clothi_grad_left(g, b, g->q, g->krylov);
    for (turn = 0; turn < CLOTHI_GRAD_TURNS && !status && left > most * size; turn++) {
        for (it = 0; it < CLOTHI_GRAD_KRYLOV && !status && left > 0.5 * most * size; it++)
            status = clothi_grad_gcr(g, &line->goal.e, it, z, &left);
        if (!status) status = clothi_grad_apply(g, &line->goal.e, z, g->q);
        left = clothi_grad_left(g, b, g->q, g->krylov);
    }
    *r = size <= 0 ? 0 : left / size;
    return status;
}

static void clothi_grad_scale(const clothi_grad *g, double *a, int exponent) {
    size_t i;
    for (i = 0; i < g->t->nv3; i++) a[i] = ldexp(a[i], exponent);
}

/* z = H^-1 b over the free leaders; g->q = H z, all rows. The largest of b is near 1 meanwhile:
 * squares of a loss's numbers may be beyond doubles, or 0. */
static cloth_status clothi_grad_solve(clothi_grad *g, clothi_line *line, double *b, double *z,
                                      int k) {
    const cloth_linear method = clothi_grad_method(g);
    cloth_status status;
    const int    touching = g->elastic || (!(line->h > 0) && clothi_static_lags(g->s));
    double       r = 0;
    int          negative = 0, size = 0;
    g->paired = 0;
    (void)frexp(clothi_max_abs(b, (int)g->t->nv3), &size);
    clothi_grad_scale(g, b, -size);
    if (touching) status = clothi_grad_touching(g, line, b, z, &negative, &r);
    else status = clothi_grad_refine(g, method, b, z, &negative, &r);
    if (!touching && !status && negative && method != CLOTH_LINEAR_CHOLESKY)
        status = clothi_grad_refine(g, CLOTH_LINEAR_CHOLESKY, b, z, &negative, &r);
    if (status) return status;
    clothi_grad_scale(g, b, size), clothi_grad_scale(g, z, size);
    clothi_grad_scale(g, g->q, size);
    g->rep->solves++;
    g->rep->negative += negative;
    if (negative) clothi_grad_doubt(g, CLOTH_GRAD_SADDLE, k);
    g->rep->residual = clothi_max(g->rep->residual, r);
    if (!(r <= 1e3 * g->t->opt.tolerance)) clothi_grad_doubt(g, CLOTH_GRAD_RESIDUAL, k);
    return status;
}

/* The matrix at w.x; where that is looked at, the force that the forward step left, into w.rhs, and
 * the update that it asks for at most, m. */
static cloth_status clothi_grad_assemble(clothi_grad *g, clothi_line *line, double *most) {
    cloth_sim   *s = g->s;
    const int    look = g->t->opt.early > 0;
    cloth_status status = clothi_objective(s, &line->goal, s->w.x, look ? s->w.grad : NULL, 1, 0,
                                           NULL);
    *most = 0;
    if (!status && s->model->tie) status = clothi_tie_matrix(s);
    if (!look || status) return status;
    clothi_newton_rhs(s);
    *most = clothi_newton_pull(s) * (line->weight > 0 ? 1 / line->weight : 1);
    return status;
}

#define CLOTHI_GRAD_ARRIVED 1e-13           /* m, an update that is rounding                   */

/* How contact's part of J' z changes from w.x to w.dx, where Newton's method would go: into
 * w.grad. */
static cloth_status clothi_grad_bend(clothi_grad *g, const clothi_line *line, const double *z) {
    cloth_sim   *s = g->s;
    cloth_eval   e = line->goal.e;
    cloth_status status = CLOTH_OK;
    cloth_vjp    to;
    int          i, j;
    memset(&to, 0, sizeof to);
    to.x = g->nv;
    for (j = 0; j < 2 && !status; j++) {
        int done = 1;
        e.x = j ? s->w.x : s->w.dx;
        memset(g->nx, 0, g->t->nv3 * sizeof(double));
        memset(g->nv, 0, g->t->nv3 * sizeof(double));
        status = s->contact.update(s->contact.user, e.x, g->nx, &done);
        if (!status) status = s->contact.vjp(s->contact.user, &e, z, &to);
        for (i = 0; i < (int)g->t->nv3; i++) s->w.grad[i] += j ? -g->nv[i] : g->nv[i];
    }
    return status;
}

/* See 'What an early stop costs'. b = T' a, z its solution with followers; w.rhs the force left. */
static cloth_status clothi_grad_early(clothi_grad *g, const clothi_line *line, double most,
                                      const double *b, const double *z, int k) {
    cloth_sim   *s = g->s;
    const int    n = 3 * s->model->nv;
    cloth_status status = CLOTH_OK;
    double       sum = 0, size = 0, part = 1, left, big = clothi_max_abs(b, n);
    int          i;
    if (line->weight > 0 && most < CLOTHI_GRAD_ARRIVED) return CLOTH_OK;
    if (g->paired) memcpy(g->left, s->w.dx, (size_t)n * sizeof(double));
    else status = clothi_grad_method(g) == CLOTH_LINEAR_CHOLESKY && s->matrix->ne == 0
                      ? cloth_factor_solve(s->solver->factor, s->w.rhs, g->left)
                      : clothi_grad_again(g, s->w.rhs, 1e-3, g->left);
    if (status) return status;
    clothi_tie_spread(s->model, g->left);
    left = clothi_max_abs(g->left, n);
    g->rep->left_m = clothi_max(g->rep->left_m, left);
    if (!(left > CLOTHI_GRAD_ARRIVED)) return CLOTH_OK;
    if (s->contact_on) status = s->contact.max_step(s->contact.user, s->w.x, g->left, &part);
    if (status) return status;
    for (i = 0; i < n; i++) g->left[i] = s->w.x[i] + part * g->left[i];
    memcpy(s->w.dx, g->left, (size_t)n * sizeof(double));
    clothi_hessian_times(s, &line->goal.e, g->left, z, s->w.grad);
    clothi_hessian_times(s, &line->goal.e, s->w.x, z, g->left);
    for (i = 0; i < n; i++) s->w.grad[i] -= g->left[i];
    if (s->contact_on) status = clothi_grad_bend(g, line, z);
    clothi_tie_gradient(s->model, s->w.grad);
    for (i = 0; i < n; i++) {
        if (s->fixed[i / 3] >> i % 3 & 1) continue;
        sum += s->w.grad[i] / big * (s->w.grad[i] / big);   /* squares of b may be beyond doubles */
        size += b[i] / big * (b[i] / big);
    }
    if (status) return status;
    if (size > 0)                           /* not NaN */
        g->rep->early += part > 0 && sum <= HUGE_VAL ? sqrt(sum / size) / part : HUGE_VAL;
    if (g->rep->early > g->t->opt.early) clothi_grad_doubt(g, CLOTH_GRAD_EARLY, k);
    return CLOTH_OK;
}

/* --- to the parameters --- */

/* Something asks for the elements' vjp: a parameter of theirs, or damping. */
static int clothi_grad_wanted(const clothi_grad *g) {
    const cloth_grad *o = g->out;
    return o->membrane || o->poisson || o->bending || o->damping || o->theta0 || o->X ||
           o->hinge_scale || g->s->own.tau > 0;
}

typedef struct clothi_worth {               /* stretch or bending, backwards                   */
    const cloth_sim       *s;
    const clothi_elements *el;
    const double          *x, *x_n, *a;     /* x_n NULL: without damping                       */
    double                 inv_h;
    int                    by_x_n;          /* forces: a' d(grad)/dx_n, else H a               */
    double                *sum;
} clothi_worth;

static void clothi_worth_range(int begin, int end, int worker, void *ctx) {
    enum { L = CLOTHI_LANES };
    const clothi_worth *p = (const clothi_worth *)ctx;
    const clothi_group *g = p->el->group;
    const int           nd = p->el->kind->nrest * L;
    const double       *rest, *start;
    double x[12 * L], x_n[12 * L], a[12 * L], damp[L], d[8 * L], other[12 * L];
    int    b, k;
    (void)worker;
    for (k = 0; k < L; k++) d[nd + k] = 0;
    for (b = begin; b < end; b++) {
        double *force = p->s->own.force + g->force + (size_t)b * (size_t)g->width * 3 * L;
        double *sum = p->sum + (size_t)b * (size_t)(nd + L);
        clothi_corners(g, p->x, b, x);
        clothi_corners(g, p->a, b, a);
        if (p->x_n) clothi_corners(g, p->x_n, b, x_n);
        clothi_batch_rest(p->el, b, p->inv_h, &rest, &start, damp);
        p->el->kind->vjp(x, p->x_n ? x_n : x, a, rest, damp, d, d + nd,
                         p->by_x_n ? force : other, p->by_x_n ? other : force);
        for (k = 0; k < nd; k++) sum[k] += d[k];
        for (k = 0; k < L; k++) sum[nd + k] += p->inv_h * d[nd + k];
    }
}

/* What the elements' rest is worth joins the sums. Ha NULL: a' d(grad)/dx_n of damping is added to
 * x_n, where given; else H a becomes Ha, of what is not damped. */
static void clothi_grad_elements(clothi_grad *g, const cloth_eval *e, const double *a, double *x_n,
                                 double *Ha) {
    cloth_sim   *s = g->s;
    const int    damped = e->h > 0 && s->own.tau > 0;
    clothi_worth p;
    size_t       i;
    p.s = s;
    p.x = e->x;
    p.x_n = damped || (e->h > 0 && g->out->damping && !Ha) ? e->x_n : NULL;
    p.a = a;
    p.inv_h = p.x_n ? 1 / e->h : 0;
    p.by_x_n = !Ha;
    for (i = 0; i < 2; i++) {
        p.el = i ? &s->own.bend : &s->own.membrane;
        p.sum = g->sum[i];
        clothi_for(&s->hooks, p.el->group->nbatch, CLOTHI_CHUNK, clothi_worth_range, &p);
    }
    if (Ha) clothi_gather_forces(s, Ha);
    else if (damped && x_n) {
        clothi_gather_forces(s, g->left);
        for (i = 0; i < g->t->nv3; i++) x_n[i] += g->left[i];
    }
}

/* Terms [from, to) of step k: a' d(grad)/d{...} to where it belongs; x_n, v_n may be NULL. */
static cloth_status clothi_grad_terms(clothi_grad *g, const cloth_eval *e, const double *a, int k,
                                      int from, int to, double *x_n, double *v_n) {
    cloth_sim   *s = g->s;
    cloth_status status = CLOTH_OK;
    cloth_vjp    to_p;
    int          i;
    memset(&to_p, 0, sizeof to_p);
    to_p.x_n = x_n;
    to_p.v_n = v_n;
    if (g->out->force) to_p.force = g->out->force + (size_t)k * g->t->nv3;
    to_p.mass = g->mass;
    to_p.own = 1;
    to_p.gravity = g->out->gravity;
    to_p.wind = g->out->wind;
    to_p.attach_k = g->out->attach_k;
    for (i = from; i < to && !status; i++)
        status = s->term[i].vjp(s->term[i].user, e, a, &to_p);
    return status;
}

/* Goals of attachments, for a force by -z: a = -z. */
static void clothi_grad_goals(clothi_grad *g, const double *a) {
    const cloth_sim *s = g->s;
    const double     share = s->in.share[1];
    double           ap[3], w[6];
    int              i, j, v[6];
    for (i = 0; i < s->in.nattach; i++) {
        const cloth_step_attachment *q = s->in.attach + i;
        if (!clothi_attach_gap(s->model, NULL, q, a, v, w, ap)) continue;
        for (j = 0; j < 3; j++) {
            g->aim[3 * i + j] -= share * q->k * ap[j];
            g->pose[3 * i + j] -= (1 - share) * q->k * ap[j];
        }
    }
}

/* Slot i was attached between step `at` and the one before: another number is in `made`. */
static int clothi_grad_fresh(const clothi_grad *g, int i) {
    const clothi_taped *e = g->t->step + g->at;
    const uint32_t     *which = (const uint32_t *)(const void *)(e->word + e->nword);
    const clothi_field *q = clothi_fields;
    uint32_t            made[2] = {0, 0};
    size_t              n, at = 0;
    for (; q->at != offsetof(cloth_sim, made); q++)
        if (clothi_field_kind(q) == CLOTHI_INPUTS)
            at += (clothi_field_count(g->s, q) * q->size + 7) / 8;
    for (n = 0; g->at > 0 && n < e->nword; n++)
        if (which[n] == at + (size_t)i / 2) memcpy(made, e->word + n, sizeof made);
    return made[i % 2] != 0;
}

/* At the start x of a step: poses of what was attached since the last step are points of x. */
static void clothi_grad_poses(clothi_grad *g, const double *x, double *to) {
    const cloth_sim *s = g->s;
    double           p[3], w[6];
    int              i, j, n, v[6];
    for (i = 0; s->nattach > 0 && i < s->model->desc.max_attachments; i++) {
        double *pose = g->pose + 3 * i;
        n = clothi_attach_gap(s->model, NULL, s->attach + i, x, v, w, p);
        if (n && !clothi_grad_fresh(g, i)) continue;
        for (j = 0; j < 3 * n; j++) to[3 * v[j / 3] + j % 3] += w[j / 3] * pose[j % 3];
        pose[0] = pose[1] = pose[2] = 0;
    }
}

/* --- the adjoint of a substep --- */

/* Goals of pins, z and H z known: to targets and to the start of the step. */
static void clothi_grad_pins(clothi_grad *g, const double *b, int k) {
    const cloth_sim *s = g->s;
    const double     share = s->in.share[1];
    size_t           i;
    for (i = 0; i < g->t->nv3; i++) {
        const double goal = b[i] - g->q[i];
        if (!(s->pin[i / 3] >> i % 3 & 1) || (s->model->tie && s->model->tie[i] >= 0)) continue;
        if (g->out->pin) g->out->pin[(size_t)k * g->t->nv3 + i] += share * goal;
        g->x0[i] += (1 - share) * goal;
    }
}

/* What z is worth to y, masses and terms. */
static cloth_status clothi_grad_spread(clothi_grad *g, clothi_line *line, int k) {
    cloth_sim   *s = g->s;
    cloth_status status;
    size_t       i;
    for (i = 0; i < g->t->nv3; i++) {
        const double wz = line->weight * g->z[i], my = s->params.mass[i / 3] * wz;
        g->nx[i] = line->yx * my + line->vn * g->lv[i] + g->lp[i];
        g->nv[i] = line->yv * my + g->lw[i];
        g->np[i] = line->yp * my + line->vp * g->lv[i];
        g->nw[i] = line->yw * my;
        g->mass[i / 3] -= wz * (s->w.x[i] - s->w.y[i]);
        g->a[i] = -g->z[i];
    }
    clothi_grad_goals(g, g->a);
    line->goal.e.grad = NULL;
    line->goal.e.hess = NULL;
    line->goal.e.x = s->w.x;
    if (clothi_grad_wanted(g))
        clothi_grad_elements(g, &line->goal.e, g->a, line->h > 0 ? g->nx : NULL, NULL);
    status = clothi_grad_terms(g, &line->goal.e, g->a, k, CLOTHI_TERM_BEND + 1, s->nterms,
                               line->h > 0 ? g->nx : NULL, line->h > 0 ? g->nv : NULL);
    if (!status && s->contact_on) {
        cloth_vjp to;
        memset(&to, 0, sizeof to);
        to.x_n = g->nx;
        status = s->contact.vjp(s->contact.user, &line->goal.e, g->a, &to);
        if (to.frozen) clothi_grad_doubt(g, CLOTH_GRAD_FROZEN, k);
    }
    return status;
}

/* l after the substep becomes n before it. */
static cloth_status clothi_grad_substep(clothi_grad *g, clothi_line *line, int k) {
    cloth_sim   *s = g->s;
    const int    look = g->t->opt.early > 0;
    cloth_status status;
    double       most = 0;
    size_t       i;
    for (i = 0; i < g->t->nv3; i++) g->a[i] = g->lx[i] + line->vx * g->lv[i];
    if (g->elastic) {                       /* x moves what contact carries to the next substep */
        cloth_vjp to;
        memset(&to, 0, sizeof to);
        to.x = g->a;
        status = s->contact.vjp(s->contact.user, &line->goal.e, NULL, &to);
        if (status) return status;
    }
    clothi_tie_gradient(s->model, g->a);    /* T' a */
    status = clothi_grad_assemble(g, line, &most);
    if (!status) status = clothi_grad_solve(g, line, g->a, g->z, k);
    if (status) return status;
    clothi_grad_pins(g, g->a, k);
    clothi_tie_spread(s->model, g->z);
    if (look && !(g->rep->doubt & CLOTH_GRAD_SADDLE))
        status = clothi_grad_early(g, line, most, g->a, g->z, k);
    return status ? status : clothi_grad_spread(g, line, k);
}

/* ===== [4.3] LEAPFROG ========================================================================
 *
 *   kick k = 0 .. m    v' = v + c_k (G - F(x, v)/M)          c_k = hs, at both ends hs/2
 *   drift k < m        x' = x + hs v'                        pins: x' = x0 + s (target - x0),
 *                                                                  v' = (target - x0)/h
 *   backwards, from lx = dL/dx', lv = dL/dv':
 *   drift              lv += hs lx
 *   kick               u = -c_k lv/M on free axes;   lx += H u + vjp_x(u),  lv += vjp_v(u),
 *                      dL/dp = u' dF/dp,  dL/dG = c_k sum lv,  dL/dm = c_k lv.(F/m)/m
 *
 *   contact    min |x' - x*|^2_M/2, G x' >= b, then the same of v by the rows that push, x* and v*
 *              what drift and kick have made; l = dL/dx', multipliers lambda; G: of active rows
 *              S mu = G M^-1 l, S = G M^-1 G';    l <- l - G'mu, z = M^-1 l
 *              dL/db = mu,  dL/dG_r = lambda_r z - mu_r x',  dL/dm = -z.(x' - x*)
 *              S is factored with pivots; rows that depend on others get mu = 0. What made b and G
 *              (the places at the time of impact) is contact's to tell: of rows of pass p, where p
 *              began, which is such a program's end itself, by the rows of the passes before.
 *
 * H u by clothi_hessian_times(), without a matrix. F depends on v by material damping, whose strain
 * rate is taken against x - hs v, and by wind. x and v at every kick come from running the step
 * anew: the path of a step is long, and its start is kept.
 * checked: tests/test_grad.c: differences_leapfrog, host_term; tests/test_grad_contact.c: zones
 */

/* F' u by the terms that are no elements. */
static void clothi_leap_times(const cloth_sim *s, const double *u, double *out) {
    double up[3], w[6];
    int    i, j, n, v[6];
    for (i = 0; i < s->in.nattach; i++) {
        n = clothi_attach_gap(s->model, NULL, s->in.attach + i, u, v, w, up);
        for (j = 0; j < 3 * n; j++)
            out[3 * v[j / 3] + j % 3] += s->in.attach[i].k * w[j / 3] * up[j % 3];
    }
}

/* H u of hosts' terms, whose matrix this is. */
static cloth_status clothi_leap_hosts(clothi_grad *g, cloth_eval e, const double *u, double *out) {
    cloth_sim   *s = g->s;
    cloth_status status = CLOTH_OK;
    double       energy;
    size_t       i;
    int          k;
    cloth_matrix_clear(g->elastic);
    e.hess = g->elastic;
    for (k = s->nbuiltin; k < s->nterms && !status; k++) {
        if (s->term[k].begin) status = s->term[k].begin(s->term[k].user, &e);
        if (!status) status = s->term[k].eval(s->term[k].user, &e, &energy);
    }
    cloth_matrix_mul(g->elastic, NULL, u, g->left);
    for (i = 0; i < g->t->nv3; i++) out[i] += g->left[i];
    return status;
}

/* --- impact zones --- */

#define CLOTHI_GRAD_RANK   1e-11            /* of the largest pivot: a row that others imply   */

typedef struct clothi_rows {                /* rows of a resolve, by their zones               */
    const cloth_contact_row *row;
    int     n, nzone;
    int    *start, *order;                  /* [nzone + 1], [n]                                */
    int    *list, *perm;                    /* [n] of a zone: active ones; by pivots           */
    double *rate, *moved;                   /* [n x CLOTH_ROW_RATES] adjoint; forwards, tangent */
    double *mu, *S;                         /* [n], [m x m], m the most active ones of a zone  */
    size_t  most;                           /* m                                               */
} clothi_rows;

static int clothi_row_pushes(const cloth_contact_row *r, int speeds) {
    return r->zone >= 0 && r->multiplier > 0 && (!speeds || r->impulse > 0);
}

/* n . sum w a over what is of cloth; by_mass: of a/m where it may move. */
static double clothi_row_along(const cloth_sim *s, const cloth_contact_row *r, const double *a,
                               int by_mass) {
    double sum = 0;
    int    i, k;
    for (i = 0; i < r->n; i++)
        for (k = 0; r->v[i] < s->model->nv && k < 3; k++) {
            const double term = r->w[i] * r->normal[k] * a[3 * r->v[i] + k];
            if (!by_mass) sum += term;
            else if (!(s->pin[r->v[i]] >> k & 1)) sum += term / s->params.mass[r->v[i]];
        }
    return sum;
}

/* The entry of S of two rows. */
static double clothi_row_pair(const cloth_sim *s, const cloth_contact_row *p,
                              const cloth_contact_row *q) {
    double sum = 0;
    int    i, j, k;
    for (i = 0; i < p->n; i++)
        for (j = 0; j < q->n; j++)
            for (k = 0; p->v[i] == q->v[j] && p->v[i] < s->model->nv && k < 3; k++)
                if (!(s->pin[p->v[i]] >> k & 1))
                    sum += p->w[i] * q->w[j] * p->normal[k] * q->normal[k] /
                           s->params.mass[p->v[i]];
    return sum;
}

static cloth_status clothi_rows_open(clothi_grad *g, clothi_rows *q) {
    int *at, i, most = 0;
    q->row = g->s->contact.rows(g->s->contact.user, &q->n);
    for (i = 0; i < q->n; i++)
        if (q->row[i].zone >= q->nzone) q->nzone = q->row[i].zone + 1;
    at = (int *)clothi_alloc(&g->t->hooks, (size_t)(3 * q->n + q->nzone + 2), sizeof(int));
    if (!at) return CLOTH_ERR_MEMORY;
    q->start = at, q->order = at + q->nzone + 2, q->list = q->order + q->n;
    q->perm = q->list + q->n;
    for (i = 0; i < q->n; i++)
        if (q->row[i].zone >= 0) q->start[q->row[i].zone + 2]++;
    for (i = 2; i < q->nzone + 2; i++) {
        most = q->start[i] > most ? q->start[i] : most;
        q->start[i] += q->start[i - 1];
    }
    for (i = 0; i < q->n; i++)
        if (q->row[i].zone >= 0) q->order[q->start[q->row[i].zone + 1]++] = i;
    q->most = (size_t)most;
    q->rate = (double *)clothi_alloc(&g->t->hooks, (size_t)q->n * (2 * CLOTH_ROW_RATES + 1) +
                                                   q->most * q->most + 1, sizeof(double));
    if (!q->rate) return CLOTH_ERR_MEMORY;
    q->moved = q->rate + CLOTH_ROW_RATES * q->n, q->mu = q->moved + CLOTH_ROW_RATES * q->n;
    q->S = q->mu + q->n;
    return CLOTH_OK;
}

static void clothi_rows_close(clothi_grad *g, clothi_rows *q) {
    clothi_free(&g->t->hooks, q->start);
    clothi_free(&g->t->hooks, q->rate);
    memset(q, 0, sizeof *q);
}

/* S of the rows in list [m] is factored, pivots first, by perm; returns its rank. */
static int clothi_rows_factor(const cloth_sim *s, clothi_rows *q, int m) {
    const size_t ld = q->most;
    double      *S = q->S, first = 0;
    int          i, j, k, p;
    for (i = 0; i < m; i++)
        for (q->perm[i] = i, j = 0; j <= i; j++)
            S[(size_t)i * ld + (size_t)j] = S[(size_t)j * ld + (size_t)i] =
                clothi_row_pair(s, q->row + q->list[i], q->row + q->list[j]);
    for (k = 0; k < m; k++) {
        double root, *from;
        for (p = i = k; i < m; i++)
            if (S[(size_t)q->perm[i] * (ld + 1)] > S[(size_t)q->perm[p] * (ld + 1)]) p = i;
        i = q->perm[k], q->perm[k] = q->perm[p], q->perm[p] = i;
        from = S + q->perm[k];
        root = from[(size_t)q->perm[k] * ld];
        if (k == 0) first = root;
        if (!(root > CLOTHI_GRAD_RANK * first)) return k;
        root = sqrt(root);
        for (i = k; i < m; i++) from[(size_t)q->perm[i] * ld] /= root;
        for (i = k + 1; i < m; i++)
            for (j = k + 1; j < m; j++)
                S[(size_t)q->perm[i] * ld + (size_t)q->perm[j]] -=
                    from[(size_t)q->perm[i] * ld] * from[(size_t)q->perm[j] * ld];
    }
    return m;
}

/* S mu = mu for the rows in list [m]. */
static void clothi_rows_solve(clothi_grad *g, clothi_rows *q, int m) {
    const int     rank = clothi_rows_factor(g->s, q, m), *p = q->perm;
    const size_t  ld = q->most;
    const double *S = q->S;
    int           i, j;
    g->rep->rows += m, g->rep->redundant += m - rank;
    for (i = rank; i < m; i++) q->mu[q->list[p[i]]] = 0;
    for (i = 0; i < rank; i++) {
        double *t = q->mu + q->list[p[i]];
        for (j = 0; j < i; j++) *t -= S[(size_t)p[i] * ld + (size_t)p[j]] * q->mu[q->list[p[j]]];
        *t /= S[(size_t)p[i] * (ld + 1)];
    }
    for (i = rank - 1; i >= 0; i--) {
        double *t = q->mu + q->list[p[i]];
        for (j = i + 1; j < rank; j++)
            *t -= S[(size_t)p[j] * ld + (size_t)p[i]] * q->mu[q->list[p[j]]];
        *t /= S[(size_t)p[i] * (ld + 1)];
    }
}

/* report.margin: how far row r is from a change, unless it repeats one of the m that push. */
static void clothi_row_margin(clothi_grad *g, const clothi_rows *q, int m,
                              const cloth_contact_row *r, const double *x, int speeds, double hs) {
    const double own = clothi_row_pair(g->s, r, r);
    double       off = fabs(clothi_row_along(g->s, r, x, 0) - (speeds ? r->speed : r->bound));
    if (speeds && !(r->multiplier > 0)) return;
    if (clothi_row_pushes(r, speeds)) off = (speeds ? r->impulse : r->multiplier) * own, m = 0;
    while (m-- > 0) {                       /* |cos| = 1 between their normals */
        const cloth_contact_row *p = q->row + q->list[m];
        const double             both = clothi_row_pair(g->s, r, p);
        if (both * both >= (1 - 1e-12) * own * clothi_row_pair(g->s, p, p)) return;
    }
    g->rep->margin = clothi_min(g->rep->margin, off * (speeds ? hs : 1));
}

/* The program on places (or speeds) backwards: a = dL/dx' becomes dL/dx*; x' and x* given. */
static void clothi_rows_back(clothi_grad *g, clothi_rows *q, int speeds, double hs,
                             const double *x, const double *x0, double *a) {
    const cloth_sim *s = g->s;
    int              z, i, j, k, m;
    size_t           l;
    for (z = 0; z < q->nzone; z++) {
        for (i = q->start[z], m = 0; i < q->start[z + 1]; i++)
            if (clothi_row_pushes(q->row + q->order[i], speeds)) q->list[m++] = q->order[i];
        for (i = q->start[z]; i < q->start[z + 1]; i++)
            clothi_row_margin(g, q, m, q->row + q->order[i], x, speeds, hs);
        for (i = 0; i < m; i++)
            q->mu[q->list[i]] = clothi_row_along(s, q->row + q->list[i], a, 1);
        clothi_rows_solve(g, q, m);
        for (i = 0; i < m; i++) {
            const cloth_contact_row *r = q->row + q->list[i];
            for (j = 0; j < r->n; j++)
                for (k = 0; r->v[j] < s->model->nv && k < 3; k++)
                    a[3 * r->v[j] + k] -= q->mu[q->list[i]] * r->w[j] * r->normal[k];
        }
        for (i = 0; i < m; i++) {
            const cloth_contact_row *r = q->row + q->list[i];
            const double lambda = speeds ? r->impulse : r->multiplier, mu = q->mu[q->list[i]];
            double      *rate = q->rate + CLOTH_ROW_RATES * q->list[i];
            rate[7 + speeds] += mu;
            for (j = 0; j < r->n; j++)
                for (k = 0; r->v[j] < s->model->nv && k < 3; k++) {
                    const int    at = 3 * r->v[j] + k, held = s->pin[r->v[j]] >> k & 1;
                    const double c = (held ? 0 : lambda * a[at] / s->params.mass[r->v[j]]) -
                                     mu * x[at];
                    rate[k] += r->w[j] * c;
                    rate[3 + j] += r->normal[k] * c;
                }
        }
    }
    for (l = 0; l < g->t->nv3; l++)
        if (!(s->pin[l / 3] >> l % 3 & 1))
            g->mass[l / 3] -= a[l] / s->params.mass[l / 3] * (x[l] - x0[l]);
}

/* Contact at the end of the drift from x, v at a kick, which are followed by what it was given, to
 * where `pass` begins, 0: to its end: places and speeds into w, its rows. */
static cloth_status clothi_leap_resolve(clothi_grad *g, double hs, const double *x, int pass,
                                        clothi_rows *q) {
    cloth_sim    *s = g->s;
    const size_t  n = g->t->nv3, bytes = n * sizeof(double);
    cloth_status  status;
    clothi_rows_close(g, q);
    memcpy(s->w.x, x, bytes);
    memcpy(s->w.trial, x + n, bytes);
    status = clothi_leap_contact(s, hs, 0, NULL);
    memcpy(s->w.x, x + 2 * n, bytes);
    memcpy(s->w.trial, x + 3 * n, bytes);
    (void)s->contact.adjoint(s->contact.user, CLOTH_ADJOINT_PASS, pass, NULL);
    if (!status) status = clothi_leap_contact(s, hs, 1, NULL);
    (void)s->contact.adjoint(s->contact.user, CLOTH_ADJOINT_PASS, 0, NULL);
    return status ? status : clothi_rows_open(g, q);
}

typedef struct clothi_passes {              /* of a resolve                                    */
    int     n;
    double *x, *d;                          /* [n x nv x 3] m, where each began; d of that     */
} clothi_passes;

/* The passes whose rows push at the end, which is in w and q where there is one alone. *frozen: the
 * end is not `next`, what the step had: contact remembers more than a step's start. */
static cloth_status clothi_passes_open(clothi_grad *g, double hs, const double *x,
                                       const double *next, clothi_passes *p, clothi_rows *q,
                                       int *frozen) {
    const cloth_sim *s = g->s;
    const size_t     n = g->t->nv3, bytes = n * sizeof(double);
    cloth_status     status = clothi_leap_resolve(g, hs, x, 0, q);
    int              i;
    *frozen = memcmp(s->w.x, next, bytes) != 0 || memcmp(s->w.trial, next + n, bytes) != 0;
    for (p->n = 1, i = 0; i < q->n; i++)
        if (q->row[i].multiplier > 0 && q->row[i].pass >= p->n) p->n = q->row[i].pass + 1;
    p->x = (double *)clothi_alloc(&g->t->hooks, 2 * (size_t)p->n * n, sizeof(double));
    if (!p->x) return CLOTH_ERR_MEMORY;
    p->d = p->x + (size_t)p->n * n;
    memcpy(p->x, x + 2 * n, bytes);
    for (i = 1; i < p->n && !status; i++) {
        status = clothi_leap_resolve(g, hs, x, i, q);
        memcpy(p->x + (size_t)i * n, s->w.x, bytes);
    }
    return status;
}

/* What made the rows of a pass, to `to` from where it began, and to g->np by x. 1: something was
 * frozen. */
static int clothi_rows_made(clothi_grad *g, const clothi_rows *q, const clothi_passes *p, int pass,
                            double *to) {
    cloth_eval e = clothi_eval_of(g->s);
    cloth_vjp  by;
    memset(&by, 0, sizeof by);
    e.x = p->x + (size_t)pass * g->t->nv3;
    by.x = to, by.x_n = g->np, by.pass = pass;
    g->s->contact.rows_vjp(g->s->contact.user, &e, q->rate, &by);
    return by.frozen;
}

/* That backwards: lx and lv before it, and into g->np what goes to x. */
static cloth_status clothi_leap_touch(clothi_grad *g, double hs, const double *x,
                                      const double *next, int k) {
    cloth_sim    *s = g->s;
    const size_t  n = g->t->nv3;
    clothi_passes p = {0, NULL, NULL};
    clothi_rows   q;
    cloth_status  status;
    int           frozen, at, i;
    size_t        l;
    memset(g->np, 0, n * sizeof(double));
    memset(&q, 0, sizeof q);
    if (memcmp(x + 2 * n, next, 2 * n * sizeof(double)) == 0) return CLOTH_OK;
    status = clothi_passes_open(g, hs, x, next, &p, &q, &frozen);
    for (at = p.n; at > 0 && !status; at--) {           /* the end, then where passes began */
        double *a = at == p.n ? g->lx : p.d + (size_t)at * n;
        if (p.n > 1) status = clothi_leap_resolve(g, hs, x, at % p.n, &q);
        if (status) break;
        if (at == p.n) clothi_rows_back(g, &q, 1, hs, s->w.trial, x + 3 * n, g->lv);
        clothi_rows_back(g, &q, 0, hs, s->w.x, x + 2 * n, a);
        for (l = 0; l < n && at < p.n; l++) g->lx[l] += a[l];
        for (i = 0; i < at; i++)
            frozen |= clothi_rows_made(g, &q, &p, i, i ? p.d + (size_t)i * n : g->lx);
    }
    if (!status && frozen) clothi_grad_doubt(g, CLOTH_GRAD_FROZEN, k);
    clothi_rows_close(g, &q);
    clothi_free(&g->t->hooks, p.x);
    return status;
}

/* u of kick k at x, v with v' after it; gravity and masses take theirs. */
static void clothi_leap_impulse(clothi_grad *g, double kick, const double *v, const double *after) {
    const cloth_sim *s = g->s;
    size_t           i;
    for (i = 0; i < g->t->nv3; i++) {
        const double m = s->params.mass[i / 3], G = s->in.gravity[i % 3];
        g->a[i] = 0;
        if (s->pin[i / 3] >> i % 3 & 1) continue;
        g->a[i] = -kick * g->lv[i] / m;
        if (g->out->gravity) g->out->gravity[i % 3] += kick * g->lv[i];
        g->mass[i / 3] += g->lv[i] / m * (kick * G - (after[i] - v[i]));
    }
}

/* H u of the forces at a kick at x, v into out; *e: where elements take them, with damping's x_n in
 * g->nx, *o: the other terms, which have begun. Returns whether it damps; *status. */
static int clothi_leap_forces(clothi_grad *g, double hs, const double *x, const double *v,
                              const double *u, double *out, cloth_eval *e, cloth_eval *o,
                              cloth_status *status) {
    cloth_sim *s = g->s;
    const int  damped = s->own.tau > 0;
    size_t     i;
    *o = clothi_eval_of(s);
    o->x = o->x_n = x;
    o->v_n = v;
    *e = *o;
    o->h = 0, e->h = hs;
    for (i = 0; i < g->t->nv3 && damped; i++) g->nx[i] = x[i] - hs * v[i];
    if (damped) e->x_n = g->nx;
    *status = CLOTH_OK;
    for (i = 0; i <= CLOTHI_TERM_BEND && damped && !*status; i++)
        *status = s->term[i].begin(s->term[i].user, e);
    if (damped || g->forwards || !clothi_grad_wanted(g)) clothi_hessian_times(s, e, x, u, out);
    else clothi_grad_elements(g, e, u, NULL, out);
    clothi_leap_times(s, u, out);
    if (!*status && s->nterms > s->nbuiltin) *status = clothi_leap_hosts(g, *o, u, out);
    if (!*status && s->wind_on)
        *status = s->term[CLOTHI_TERM_WIND].begin(s->term[CLOTHI_TERM_WIND].user, o);
    return damped;
}

/* The kick k of m at x, v: lx, lv from after it to before it. */
static cloth_status clothi_leap_back(clothi_grad *g, double hs, const double *x, const double *v,
                                     int k) {
    cloth_eval   e, o;
    cloth_status status;
    const int    damped = clothi_leap_forces(g, hs, x, v, g->a, g->q, &e, &o, &status);
    size_t       i, n = g->t->nv3;
    for (i = 0; i < n; i++) g->lx[i] += g->q[i];
    if (damped) {
        memset(g->z, 0, n * sizeof(double));
        clothi_grad_elements(g, &e, g->a, g->z, NULL);
        for (i = 0; i < n; i++) {
            g->lx[i] += g->z[i];
            g->lv[i] -= hs * g->z[i];
        }
    }
    clothi_grad_goals(g, g->a);
    return status ? status : clothi_grad_terms(g, &o, g->a, k, CLOTHI_TERM_FORCE, g->s->nterms,
                                               g->lx, g->lv);
}

/* Pinned axes before the kick k: their v, and their x at the drift's end, are given. */
static void clothi_leap_held(clothi_grad *g, double h, double share, int drift, int k) {
    const cloth_sim *s = g->s;
    double          *pin = g->out->pin ? g->out->pin + (size_t)k * g->t->nv3 : NULL;
    size_t           i;
    for (i = 0; i < g->t->nv3; i++) {
        double target, start;
        if (!(s->pin[i / 3] >> i % 3 & 1)) continue;
        target = g->lv[i] / h;
        start = -target;
        g->lv[i] = 0;
        if (drift) {
            target += share * g->lx[i];
            start += (1 - share) * g->lx[i];
            g->lx[i] = 0;
        }
        if (pin) pin[i] += target;
        g->x0[i] += start;
    }
}

/* Step k, whose trace is in the tape: `kicks` pairs of x and v; v_end after the last of them. */
static cloth_status clothi_leap_adjoint(clothi_grad *g, double h, const double *v_end, int kicks,
                                        int k) {
    cloth_sim    *s = g->s;
    const size_t  n = g->t->nv3, each = clothi_tape_each(g->t);
    const int     m = kicks - 1, touches = s->contact_on;
    const double  hs = h / m;
    cloth_status  status = CLOTH_OK;
    int           j;
    size_t        i;
    for (j = m; j >= 0 && !status; j--) {
        const double *x = g->t->trace + each * (size_t)j, *v = x + n;
        const double *after = j < m ? v + 2 * n : v_end;        /* contact: what it was given */
        clothi_input(s, hs, (double)j / m, (double)(j + 1) / m);
        s->in.x = x;
        s->in.v = v;
        if (touches && j < m) status = clothi_leap_touch(g, hs, x, x + each, k);
        s->in.share[1] = s->in.share[0];
        for (i = 0; i < n && j < m; i++)
            if (!(s->pin[i / 3] >> i % 3 & 1)) g->lv[i] += hs * g->lx[i];
        clothi_leap_held(g, h / s->fraction, s->fraction * (j + 1) / m, j < m, k);
        for (i = 0; i < n && touches && j < m; i++) g->lx[i] += g->np[i];
        if (status) break;
        clothi_leap_impulse(g, j == 0 || j == m ? 0.5 * hs : hs, v, after);
        status = clothi_leap_back(g, hs, x, v, k);
    }
    clothi_leap_held(g, h / s->fraction, 0, 0, k);  /* v of pins is set before the first kick */
    return status;
}

CLOTHI_RARE_BEGIN

/* ===== [4.4] FROM MASSES AND LAME CONSTANTS TO MATERIALS =====================================
 *
 *   Y membrane stiffness N/m, nu, t thickness:
 *     mu = Y/(2 (1+nu))                dmu/dY = 1/(2 (1+nu))     dmu/dnu = -Y/(2 (1+nu)^2)
 *     plane stress  lambda = Y nu/(1-nu^2)                dlambda/dnu = Y (1+nu^2)/(1-nu^2)^2
 *     plane strain  lambda = Y nu/((1+nu)(1-2nu))    Y (1+2nu^2)/((1+nu)(1-2nu))^2
 *     D = Y t^2/(12 (1-nu^2)) where it is not given
 *   lumped masses m_i = sum over faces at i of rho A/3: to rho and, by A, to the rest corners.
 * checked: tests/test_grad.c: differences_*, material_derivatives
 */

/* dL/d{mu, lambda, D} of a region at its material. */
static void clothi_grad_material(const clothi_grad *g, const cloth_material *m, int r) {
    const cloth_grad *o = g->out;
    const double nu = m->poisson, Y = clothi_membrane_stiffness(m), p = 1 + nu, q = 1 - nu * nu;
    const double strain = p * (1 - 2 * nu), t2 = m->thickness * m->thickness / 12;
    const int    solid = m->plane == CLOTH_PLANE_STRAIN_3D, derived = m->bending < 0;
    if (o->membrane) {
        o->membrane[r] += g->mu[r] / (2 * p) + g->lambda[r] * nu / (solid ? strain : q);
        if (derived) o->membrane[r] += g->bending[r] * t2 / q;
    }
    if (o->poisson) {
        o->poisson[r] += -g->mu[r] * Y / (2 * p * p);
        o->poisson[r] += g->lambda[r] * Y * (solid ? (1 + 2 * nu * nu) / (strain * strain)
                                                   : (1 + nu * nu) / (q * q));
        if (derived) o->poisson[r] += g->bending[r] * Y * t2 * 2 * nu / (q * q);
    }
    if (o->bending) o->bending[r] += g->bending[r];
    if (o->damping) o->damping[r] += g->damping[r];
}

/* dL/dm of what is lumped: to density and rest corners. */
static void clothi_grad_lumped(clothi_grad *g) {
    const cloth_sim   *s = g->s;
    const cloth_model *m = s->model;
    const cloth_grad  *o = g->out;
    int                f, i, k;
    for (i = 0; i < m->nv; i++)             /* of no face: as heavy as the first corner */
        if (m->topology->vf_start[i] == m->topology->vf_start[i + 1])
            g->mass[m->faces[0]] += g->mass[i];
    for (f = 0; f < m->nf; f++) {
        const int    r = m->region[f];
        const double A = clothi_rest_area(s->params.X, f);
        double       sum = 0;
        for (k = 0; k < 3; k++) sum += g->mass[m->faces[3 * f + k]] / 3;
        if (o->density) o->density[r] += sum * A;
        if (o->X)
            clothi_rest_vjp(m, &s->params, f, m->faces[3 * f], m->faces[3 * f + 1], 0,
                            sum * s->params.material[r].density, o->X);
    }
}

/* Sums of an element's numbers: to params, which derive from them once and not once a kick. */
static void clothi_grad_rest(clothi_grad *g) {
    const cloth_sim *s = g->s;
    const cloth_eval e = clothi_eval_of(s);
    cloth_vjp        to;
    int              i, b;
    memset(&to, 0, sizeof to);
    to.mu = g->mu, to.lambda = g->lambda, to.bending = g->bending, to.damping = g->damping;
    to.theta0 = g->out->theta0, to.hinge_scale = g->out->hinge_scale, to.X = g->out->X;
    for (i = 0; i < 2; i++) {
        const clothi_elements *el = i ? &s->own.bend : &s->own.membrane;
        const size_t nd = (size_t)el->kind->nrest * CLOTHI_LANES, each = nd + CLOTHI_LANES;
        for (b = 0; b < el->group->nbatch; b++) {
            const double *d = g->sum[i] + (size_t)b * each;
            clothi_batch_params_vjp(el, &e, b, d, d + nd, &to);
        }
        memset(g->sum[i], 0, (size_t)el->group->nbatch * each * sizeof(double));
    }
}

/* What was gathered under the sim's present params goes to the results: once for each set of them,
 * so that the order of sums is that of the tape, whatever was run anew. */
static void clothi_grad_flush(clothi_grad *g) {
    const cloth_sim *s = g->s;
    const int        nr = s->model->nregions, nv = s->model->nv;
    int              i;
    if (clothi_grad_wanted(g)) clothi_grad_rest(g);
    for (i = 0; i < nr; i++) clothi_grad_material(g, s->params.material + i, i);
    for (i = 0; g->out->mass && i < nv; i++) g->out->mass[i] += g->mass[i];
    if (!s->params.mass_given && (g->out->density || g->out->X)) clothi_grad_lumped(g);
    memset(g->mass, 0, ((size_t)nv + 4 * (size_t)nr) * sizeof(double));
}

/* ===== [5.1] BACKWARDS =======================================================================
 *
 *   l = dL/dx_n, dL/dv_n                        loss, k = n
 *   for k = n-1 .. 0:   put the sim where step k began      (a slot, or steps run anew)
 *                       l <- adjoint of step k (l)          [4.2] [4.3]
 *                       l += dL/dx_k, dL/dv_k               loss, k
 *   l is dL/dx0, dL/dv0
 * A step over which l is zero is passed over.
 * checked: tests/test_grad.c
 */

/* Arrays of one walk into *g from a block, or with block NULL their bytes alone. */
static size_t clothi_grad_arrays(const cloth_sim *s, size_t motion, size_t input, clothi_grad *g,
                                 unsigned char *block) {
    const size_t n = 3 * (size_t)s->model->nv, nr = (size_t)s->model->nregions;
    const size_t na = 3 * (size_t)s->model->desc.max_attachments;
    double      *d = (double *)(void *)block;
    size_t       i, sums[2];
    for (i = 0; i < 2; i++) {
        const clothi_elements *el = i ? &s->own.bend : &s->own.membrane;
        sums[i] = (size_t)el->group->nbatch * (size_t)(el->kind->nrest + 1) * CLOTHI_LANES;
    }
    if (block) {
        double **all[CLOTHI_GRAD_ARRAYS] = {
            &g->x, &g->v, &g->lx, &g->lv, &g->lp, &g->lw, &g->nx, &g->nv, &g->np, &g->nw, &g->x0,
            &g->gx, &g->gv, &g->a, &g->z, &g->q, &g->left};
        for (i = 0; i < CLOTHI_GRAD_ARRAYS; i++, d += n) *all[i] = d;
        for (i = 0; i < 2; i++, d += sums[i - 1]) g->sum[i] = d;
        g->mass = d, d += n / 3;            /* then the four of regions: see _flush */
        g->mu = d, g->lambda = d + nr, g->bending = d + 2 * nr, g->damping = d + 3 * nr;
        d += 4 * nr;
        g->pose = d, g->aim = d + na;
        g->input = (unsigned char *)(d + 2 * na);
        g->kept_input = g->input + input;
        g->kept_motion = g->kept_input + input;
    }
    return (CLOTHI_GRAD_ARRAYS * n + sums[0] + sums[1] + n / 3 + 4 * nr + 2 * na) * sizeof(double) +
           2 * input + motion;
}

/* The sim at the start of step k: inputs, params, units and motion of the slot (NULL: it is there
 * already, but for what was dropped between steps). */
static cloth_status clothi_grad_put(clothi_grad *g, int k, const unsigned char *slot) {
    cloth_tape   *t = g->t;
    cloth_sim    *s = g->s;
    const unsigned char *p = g->input + t->fixed_input - t->params;
    cloth_status  status;
    while (g->at < k) clothi_tape_xor(t->step + ++g->at, g->input);
    while (g->at > k) clothi_tape_xor(t->step + g->at--, g->input);
    (void)clothi_tape_walk(s, CLOTHI_INPUTS, CLOTHI_LOAD, g->input);
    (void)clothi_tape_walk(s, CLOTHI_PARAMS, CLOTHI_SAVE, t->next);
    if (memcmp(t->next, p, t->params) != 0) {
        (void)clothi_tape_walk(s, CLOTHI_PARAMS, CLOTHI_LOAD, p);
        clothi_derive(s);
    }
    status = clothi_check_units(s, "cloth_grad_backward", g->input, t->fixed_input,
                                t->fixed_input + t->step[k].units);
    if (status) return status;              /* obstacles, terms or contact came or went */
    (void)clothi_tape_units(s, CLOTHI_LOAD, g->input, t->fixed_input);
    if (slot) (void)clothi_tape_walk(s, CLOTHI_MOTION, CLOTHI_LOAD, slot);
    else if (t->step[k].dropped & 1) clothi_forget(s);
    else if (t->step[k].dropped) s->still = 0;
    s->known = s->calm = 0;
    s->rested.outcome = CLOTH_STEP_NONE;
    return clothi_need_work(s);
}

/* Runs step k from where the sim is; mode: what of its path is kept in the tape's trace. */
static cloth_status clothi_grad_replay(clothi_grad *g, int k, int mode) {
    const double       h = g->t->step[k].h;
    const cloth_cancel cancel = g->s->hooks.cancel;
    cloth_status       status = clothi_cancelled(&g->t->hooks, NULL);
    if (status) return status;
    g->t->mode = mode;
    g->rep->replayed++;
    g->s->hooks.cancel.fn = NULL;           /* whose "time is up" would make it another step */
    status = h > 0 ? cloth_step(g->s, h, NULL) : cloth_solve_static(g->s, NULL);
    g->s->hooks.cancel = cancel;
    g->t->mode = CLOTHI_TAPE_DEAF;
    g->s->landing = NULL;
    return g->t->lost ? CLOTH_ERR_MEMORY : status;
}

/* Step k of LEAPFROG from `slot` once forwards for its path. */
static cloth_status clothi_leap_path(clothi_grad *g, int k, const unsigned char *slot) {
    const size_t each = clothi_tape_each(g->t);
    cloth_status status;
    if (!clothi_tape_trace(g->t, each * (size_t)g->t->step[k].substeps)) return CLOTH_ERR_MEMORY;
    status = clothi_grad_replay(g, k, CLOTHI_TAPE_TRACE);
    return status ? status : clothi_grad_put(g, k, slot);
}

/* The substeps of step k from its motion in `slot` to g->x, last one first. */
static cloth_status clothi_grad_implicit(clothi_grad *g, int k, const unsigned char *slot) {
    const cloth_tape   *t = g->t;
    const clothi_taped *e = t->step + k;
    const int     m = e->h > 0 && e->substeps > 1 ? e->substeps : 1;
    const double *ends = (const double *)(const void *)(slot + t->motion);
    clothi_line   line;
    cloth_status  status = CLOTH_OK;
    int           i, j;
    if (e->slept || !(e->h > 0))            /* v = 0 and no history, whatever came before */
        memset(g->lv, 0, 3 * t->nv3 * sizeof(double));
    for (j = m - 1; j >= 0 && !status; j--) {
        if (j < m - 1) status = clothi_grad_put(g, k, slot);
        if (!status) status = clothi_keep(g->s);
        for (i = 0; i <= j && !status; i++) {
            status = clothi_line_open(g->s, e, i, m, i < m - 1 ? ends + (size_t)i * t->nv3 : g->x,
                                      &line);
            if (!status && i < j) status = clothi_line_close(g->s, &line);
        }
        if (!status) status = clothi_grad_substep(g, &line, k);
        memcpy(g->lx, g->nx, 4 * t->nv3 * sizeof(double));
    }
    return status;
}

/* What the loss says of the state after k steps. */
static cloth_status clothi_grad_loss(clothi_grad *g, int k) {
    const size_t n = g->t->nv3;
    size_t       i;
    ptrdiff_t    at;
    memset(g->gx, 0, 2 * n * sizeof(double));
    g->loss(k, g->x, g->v, g->gx, g->gv, g->user);
    at = clothi_find_nonfinite(g->gx, 2 * n);
    if (at >= 0)
        return clothi_fail(&g->t->hooks, CLOTH_ERR_NONFINITE, "cloth_grad_backward: the loss wrote "
                           "NaN or infinity at k = %i, vertex %i", k, (int)(at % (ptrdiff_t)n / 3));
    for (i = 0; i < 2 * n; i++) g->lx[i] += g->gx[i];
    return CLOTH_OK;
}

/* Contact is told where the walk is. */
static cloth_status clothi_grad_adjoint(clothi_grad *g, int what, int k) {
    cloth_sim *s = g->s;
    if (!s->contact_on) return CLOTH_OK;
    return s->contact.adjoint(s->contact.user, what, k, &g->touch);
}

/* l over step k, whose start is in `slot`; then the loss there. */
static cloth_status clothi_grad_step(clothi_grad *g, int k, const unsigned char *slot) {
    const size_t        n = g->t->nv3, bytes = n * sizeof(double);
    const clothi_taped *e = g->t->step + k;
    const size_t        na = 3 * (size_t)g->s->model->desc.max_attachments;
    const int           moves = !e->asleep && !clothi_all_zero(g->lx, 4 * n);
    cloth_status        status = clothi_cancelled(&g->t->hooks, NULL);
    size_t              i;
    for (i = 0; i < na; i++) {              /* poses after a step are that part of the way */
        g->aim[i] = e->fraction * g->pose[i];
        g->pose[i] -= g->aim[i];
    }
    memset(g->x0, 0, bytes);
    if (!status && (moves || e->params || !clothi_all_zero(g->aim, na)))
        status = clothi_grad_put(g, k, slot);
    if (!status && moves) {
        if (e->inexact) clothi_grad_doubt(g, CLOTH_GRAD_EARLY, k);
        if (g->s->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG) {
            status = clothi_leap_path(g, k, slot);
            if (!status) status = clothi_leap_adjoint(g, e->h, g->v, g->t->traced, k);
            if (g->s->contact_on) g->s->contact.rollback(g->s->contact.user, NULL);
        } else status = clothi_grad_implicit(g, k, slot);
        for (i = 0; i < n; i++) g->lx[i] += g->x0[i];
    }
    memcpy(g->x, slot, bytes);
    if (g->at == k) clothi_grad_poses(g, g->x, g->lx);
    if (g->out->attach) memcpy(g->out->attach + (size_t)k * na, g->aim, na * sizeof(double));
    if (!status && e->params) clothi_grad_flush(g);     /* steps before it have others */
    if (!status) status = clothi_grad_adjoint(g, CLOTH_ADJOINT_STEP, k + 1);
    memcpy(g->v, slot + bytes + CLOTHI_PAD8(bytes), bytes);
    return status ? status : clothi_grad_loss(g, k);
}

/* --- between slots --- */

/* How many slots may be made now. */
static int clothi_grad_room(const cloth_tape *t) {
    const size_t held = t->bytes + t->path, left = t->opt.bytes > held ? t->opt.bytes - held : 0;
    if (!t->opt.bytes) return 0x7fffffff;
    return (int)clothi_min((double)(left / (t->slot + CLOTHI_BLOCK)), 1e9);
}

/* The sim runs from the start of step a, in `from`, to that of step b; its motion into `to`, with
 * the ends of the substeps of b where all is kept. */
static cloth_status clothi_grad_run(clothi_grad *g, int a, int b, const unsigned char *from,
                                    unsigned char *to) {
    cloth_tape  *t = g->t;
    cloth_status status = CLOTH_OK;
    int          k;
    for (k = a; k < b && !status; k++) {
        status = clothi_grad_put(g, k, k == a ? from : NULL);
        if (!status) status = clothi_grad_replay(g, k, CLOTHI_TAPE_DEAF);
    }
    if (!status) status = clothi_grad_put(g, b, b == a ? from : NULL);
    if (!status && to) (void)clothi_tape_walk(g->s, CLOTHI_MOTION, CLOTHI_SAVE, to);
    if (status || !to || t->slot == t->motion || t->step[b].substeps < 2) return status;
    status = clothi_grad_replay(g, b, CLOTHI_TAPE_TRACE);
    clothi_tape_ends(t, to);
    return status;
}

/* All slots between fit: they are filled forwards and walked backwards. */
static cloth_status clothi_grad_fill(clothi_grad *g, int a, int b, const unsigned char *from) {
    cloth_tape   *t = g->t;
    cloth_status  status = CLOTH_OK;
    int           k;
    for (k = a + 1; k < b && !status; k++) {
        t->step[k].slot = (unsigned char *)clothi_tape_alloc(t, t->slot, 1);
        status = t->step[k].slot ? clothi_grad_run(g, k - 1, k, from, t->step[k].slot)
                                 : CLOTH_ERR_MEMORY;
        from = t->step[k].slot;
    }
    for (k = b - 1; k > a; k--) {
        if (!status) status = clothi_grad_step(g, k, t->step[k].slot);
        clothi_tape_free(t, t->step[k].slot);
        t->step[k].slot = NULL;
    }
    return status;
}

/* Steps b-1 .. a, the motion at a in `from`, with no slot between. See [3.1]. */
static cloth_status clothi_grad_between(clothi_grad *g, int a, int b, const unsigned char *from) {
    cloth_tape    *t = g->t;
    const int      room = clothi_grad_room(t), mid = a + (b - a) / 2;
    unsigned char *slot;
    cloth_status   status = CLOTH_OK;
    int            k;
    if (room >= b - a - 1) {
        status = clothi_grad_fill(g, a, b, from);
    } else if (room < 1) {                  /* `here` alone: each step from a on */
        for (k = b - 1; k > a && !status; k--) {
            status = clothi_grad_run(g, a, k, from, g->here);
            if (!status) status = clothi_grad_step(g, k, g->here);
        }
    } else {                                /* the second half from a slot of its own */
        slot = (unsigned char *)clothi_tape_alloc(t, t->slot, 1);
        status = slot ? clothi_grad_run(g, a, mid, from, slot) : CLOTH_ERR_MEMORY;
        if (!status) status = clothi_grad_between(g, mid, b, slot);
        clothi_tape_free(t, slot);
        return status ? status : clothi_grad_between(g, a, mid, from);
    }
    return status ? status : clothi_grad_step(g, a, from);
}

/* --- the call --- */

/* The arrays that are asked for, as zeros. */
static void clothi_grad_clear(const cloth_tape *t, const cloth_grad *o) {
    const cloth_model *m = t->sim->model;
    const size_t n = t->nv3, nr = (size_t)m->nregions, nh = (size_t)t->sim->params.nh;
    const size_t k = (size_t)t->n, na = 3 * (size_t)m->desc.max_attachments;
    const struct { double *a; size_t n; } list[] = {
        {o->x0, n}, {o->v0, n}, {o->density, nr}, {o->membrane, nr}, {o->poisson, nr},
        {o->bending, nr}, {o->damping, nr}, {o->X, 6 * (size_t)m->nf}, {o->theta0, nh},
        {o->mass, n / 3}, {o->gravity, 3}, {o->wind, 3}, {o->force, k * n}, {o->pin, k * n},
        {o->hinge_scale, nh}, {o->attach, k * na}, {o->attach_k, na / 3}};
    size_t i;
    for (i = 0; i < sizeof list / sizeof *list; i++)
        if (list[i].a) memset(list[i].a, 0, list[i].n * sizeof(double));
}

static cloth_status clothi_grad_check(const cloth_tape *t, const cloth_grad *o) {
    const cloth_sim *s = t->sim;
    int              i;
    if (!s)
        return clothi_fail(&t->hooks, CLOTH_ERR_HANDLE, "cloth_grad: the sim of this tape is "
                           "destroyed");
    if (t->n == 0)
        return clothi_fail(&t->hooks, CLOTH_ERR_ARGUMENT, "cloth_grad: no step is recorded%s%s",
                           t->ended ? ": " : "", t->ended ? t->ended : "");
    if (s->contact_on && !(s->contact.vjp && s->contact.adjoint && s->contact.rows &&
                           s->contact.rows_vjp))
        return clothi_fail(&t->hooks, CLOTH_ERR_UNSUPPORTED, "cloth_grad: the contact of this sim "
                           "has no vjp");
    if (!s->contact_on && o && (o->friction || o->part_friction || o->obstacle))
        return clothi_fail(&t->hooks, CLOTH_ERR_UNSUPPORTED, "cloth_grad: friction or obstacle is "
                           "asked for, but this sim has no contact");
    for (i = s->nbuiltin; i < s->nterms; i++)
        if (!s->term[i].vjp)
            return clothi_fail(&t->hooks, CLOTH_ERR_UNSUPPORTED, "cloth_grad: the host's term "
                               "'%s' has no vjp", s->term[i].name ? s->term[i].name : "?");
    return CLOTH_OK;
}

/* The sim as it is into `kept`, and back. */
static void clothi_grad_keep(clothi_grad *g, int verb) {
    cloth_sim *s = g->s;
    size_t     at = clothi_tape_walk(s, CLOTHI_INPUTS, verb, g->kept_input);
    cloth_term u;
    at += clothi_tape_walk(s, CLOTHI_PARAMS, verb, g->kept_input + at);
    if (clothi_unit_at(s, 0, &u)) (void)clothi_tape_units(s, verb, g->kept_input, at);
    (void)clothi_tape_walk(s, CLOTHI_MOTION, verb, g->kept_motion);
    s->edit_stays = 1;
    if (verb != CLOTHI_LOAD) return;
    clothi_derive(s);
    s->edit_stays = s->known = 0;
    s->rested.outcome = CLOTH_STEP_NONE;
}

static cloth_status clothi_grad_open(clothi_grad *g, cloth_tape *t, const cloth_grad *out,
                                     cloth_grad_report *rep, unsigned char **block) {
    const size_t units = clothi_tape_units(t->sim, CLOTHI_SIZE, NULL, 0);
    const size_t input = clothi_max_size(t->room, t->fixed_input + units + CLOTHI_PAD8(units));
    const int    leap = t->sim->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG, none = 0;
    cloth_status status;
    memset(g, 0, sizeof *g);
    g->t = t, g->s = t->sim, g->out = out, g->rep = rep, g->at = -1;
    g->touch.friction = out->friction, g->touch.part_friction = out->part_friction;
    g->touch.obstacle = out->obstacle, g->touch.user = out->user;
    status = clothi_grad_adjoint(g, CLOTH_ADJOINT_BEGIN, 0);    /* zeros into what it is given */
    if (status) return status;
    *block = (unsigned char *)clothi_tape_alloc(
        t, clothi_grad_arrays(t->sim, t->motion, input, g, NULL), 1);
    if (!*block) return CLOTH_ERR_MEMORY;
    (void)clothi_grad_arrays(t->sim, t->motion, input, g, *block);
    g->here = (unsigned char *)clothi_tape_alloc(t, t->slot, 1);
    if (!g->here) return CLOTH_ERR_MEMORY;
    if (leap && t->sim->nterms > t->sim->nbuiltin)
        status = cloth_pattern_create(&t->sim->hooks, t->sim->model->nv, 0, &none, &none, NULL,
                                      &g->pattern);
    if (!status && g->pattern)
        status = cloth_matrix_create(&t->sim->hooks, g->pattern, &g->elastic);
    g->touch.attach = g->aim;
    if (status || !(t->lags || (t->sim->contact_on && !leap))) return status;
    g->krylov = (double *)clothi_tape_alloc(t, (2 * CLOTHI_GRAD_KRYLOV + 1) * t->nv3,
                                            sizeof(double));
    if (!g->krylov) return CLOTH_ERR_MEMORY;
    if (!t->sim->contact_on) return CLOTH_OK;
    return cloth_matrix_create(&t->sim->hooks, t->sim->model->pattern, &g->elastic);
}

static void clothi_grad_close(clothi_grad *g, unsigned char *block) {
    if (g->s->contact_on)                   /* scratch of a walk that came to no end */
        (void)g->s->contact.adjoint(g->s->contact.user, CLOTH_ADJOINT_END, 0, NULL);
    cloth_matrix_destroy(g->elastic);
    cloth_pattern_destroy(g->pattern);
    clothi_tape_free(g->t, g->krylov);
    clothi_tape_free(g->t, g->here);
    clothi_tape_free(g->t, block);
}

/* From the end of the tape to its start. */
static cloth_status clothi_grad_walk(clothi_grad *g) {
    cloth_tape  *t = g->t;
    const size_t bytes = t->nv3 * sizeof(double);
    cloth_status status;
    int          a, b = t->n;
    memcpy(g->x, t->end, bytes);
    memcpy(g->v, t->end + bytes + CLOTHI_PAD8(bytes), bytes);
    status = clothi_grad_loss(g, t->n);
    for (a = b - 1; a >= 0 && !status; a--) {
        if (!t->step[a].slot) continue;
        status = clothi_grad_between(g, a, b, t->step[a].slot);
        b = a;
    }
    return status ? status : clothi_grad_adjoint(g, CLOTH_ADJOINT_END, 0);
}

static const char *clothi_grad_why(unsigned doubt) {
    if (doubt & CLOTH_GRAD_SADDLE)
        return "a step ended where the Hessian has negative curvature";
    if (doubt & CLOTH_GRAD_EARLY)
        return "steps stopped too far from their minima: lower desc.tolerance";
    if (doubt & CLOTH_GRAD_FROZEN)
        return "contact took for constant what moves: a grid's normals, a pinch, a rigid zone";
    return doubt ? "an adjoint system was not solved to its tolerance" : "";
}

CLOTH_API cloth_status cloth_grad_backward(cloth_tape *tape, cloth_loss_fn *loss, void *user,
                                           cloth_grad *out, cloth_grad_report *rep) {
    cloth_grad_report local, *r = rep ? rep : &local;
    cloth_status      status;
    unsigned char    *block = NULL;
    clothi_grad       g;
    double            start;
    memset(r, 0, sizeof *r);
    r->step = -1, r->why = "", r->margin = HUGE_VAL, r->status = CLOTH_ERR_ARGUMENT;
    if (!tape) return CLOTH_ERR_ARGUMENT;
    if (tape->sim && out) clothi_grad_clear(tape, out);
    if (!loss || !out)
        return clothi_null(&tape->hooks, loss ? "cloth_grad_backward: out"
                                              : "cloth_grad_backward: loss");
    r->status = status = clothi_grad_check(tape, out);
    if (status) return status;
    start = clothi_now(&tape->hooks);
    r->steps = tape->n;
    status = clothi_grad_open(&g, tape, out, r, &block);
    if (!status) {
        g.loss = loss, g.user = user;
        tape->mode = CLOTHI_TAPE_DEAF;
        clothi_grad_keep(&g, CLOTHI_SAVE);
        status = clothi_grad_walk(&g);
        if (out->x0) memcpy(out->x0, g.lx, tape->nv3 * sizeof(double));
        if (out->v0) memcpy(out->v0, g.lv, tape->nv3 * sizeof(double));
        clothi_grad_keep(&g, CLOTHI_LOAD);
        tape->mode = CLOTHI_TAPE_RECORD;
        if (status) clothi_grad_clear(tape, out);
    }
    clothi_grad_close(&g, block);
    r->status = status;
    r->valid = !status && !r->doubt;
    r->why = clothi_grad_why(r->doubt);
    r->bytes = tape->most;
    r->ms = 1e3 * (clothi_now(&tape->hooks) - start);
    return status;
}

/* ===== [5.2] TANGENT, CHECK ==================================================================
 *
 *   forwards, from dx, dv, dp = d{x^n, v^n, causes}:
 *     H dx' = M/eta^2 dy - d(grad E)/dx^n dx - d(grad E)/dv^n dv - d(grad E)/dp dp
 *   on free axes, dx' given on pins; v, x^(n-1) and v^(n-1) follow as in [4.1]
 *
 * The same linearised substeps as the adjoint's, one after the other: for a loss of fixed weights w
 * the sum of w.dx over all states is what the adjoint has to find for the same direction, to
 * rounding: the dot-product test. Terms and contact know their transposed derivative alone: row i
 * of d(grad E)/d{..} is the vjp of the unit vector i. What solves, and what takes all this from
 * substep to substep, is written anew, LEAPFROG's programs too. It is for checks.
 *
 * Differences: of the sum of w.x and w.v, w the loss's gradient at the run as it is; central, at
 * steps that shrink by 4, extrapolated; of all those the one that differs least from the two that
 * it is made of [R82], and from those to either side: a kink at the run itself has two slopes,
 * however small the steps are.
 * checked: tests/test_grad_check.c
 */

#define CLOTHI_CHECK_LEVELS 6
#define CLOTHI_CHECK_CAUSES 13

typedef struct clothi_cause {               /* numbers that are moved                          */
    const char   *name;
    double       *at;                       /* first one, in the sim                           */
    const double *g;                        /* [n] derivative                                  */
    size_t        stride;                   /* bytes                                           */
    int           n, host;                  /* host: the run may set it anew                   */
    double       *size;                     /* [n] of a direction; NULL: 0; then [n], the numbers
                                               before a run                                    */
} clothi_cause;

typedef struct clothi_check {
    cloth_sim     *s;
    cloth_loss_fn *loss;
    cloth_run_fn  *run;                     /* the host's                                      */
    void          *user, *run_user;
    void          *start;                   /* [size] the sim where the run begins             */
    size_t         size;
    cloth_grad     g;
    double        *w;                       /* [n + 1][2][nv x 3] gradient of the loss         */
    double        *dx, *dv, *dp, *dq;       /* tangent of x, v and those before                */
    double        *block;                   /* [results], behind them                          */
    size_t         results;
    double         sum;
    int            k, n;                    /* states seen; steps of the tape                  */
    clothi_cause   cause[CLOTHI_CHECK_CAUSES];
    int            causes;
} clothi_check;

static double clothi_check_noise(uint32_t i) {
    i = i * 747796405u + 2891336453u;
    i = ((i >> ((i >> 28) + 4)) ^ i) * 277803737u;
    return (double)((i ^ i >> 22) >> 8) / 8388608 - 1;
}

/* Number i of the direction of a cause. */
static double clothi_check_dir(const clothi_cause *q, int i) {
    const unsigned char *name = (const unsigned char *)q->name;
    return q->size ? q->size[i] * clothi_check_noise((uint32_t)i * 131u + name[0] + 1009u * name[1])
                   : 0;
}

static double clothi_check_along(const clothi_cause *q) {
    double sum = 0;
    int    i;
    for (i = 0; i < q->n; i++) sum += q->g[i] * clothi_check_dir(q, i);
    return sum;
}

static double *clothi_check_number(const clothi_cause *q, int i) {
    return (double *)(void *)((char *)(void *)q->at + (size_t)i * q->stride);
}

static void clothi_check_move(const clothi_cause *q, double eps) {
    int i;
    for (i = 0; i < q->n; i++) *clothi_check_number(q, i) += eps * clothi_check_dir(q, i);
}

/* The loss, whose gradient is kept. */
static void clothi_check_loss(int k, const double *x, const double *v, double *gx, double *gv,
                              void *user) {
    clothi_check *c = (clothi_check *)user;
    const size_t  n = 3 * (size_t)c->s->model->nv;
    c->loss(k, x, v, gx, gv, c->user);
    memcpy(c->w + 2 * n * (size_t)k, gx, 2 * n * sizeof(double));      /* and gv */
}

/* Weights of state k times x, v. */
static void clothi_check_weigh(clothi_check *c, int k, const double *x, const double *v) {
    const size_t  n = 3 * (size_t)c->s->model->nv;
    const double *w = c->w + 2 * n * (size_t)k;
    size_t        i;
    for (i = 0; k <= c->n && i < n; i++) c->sum += w[i] * x[i] + w[n + i] * v[i];
}

static void clothi_check_heard(void *user, const cloth_step_record *r) {
    clothi_check *c = (clothi_check *)user;
    clothi_check_weigh(c, ++c->k, r->x, r->v);
}

/* --- tangent --- */

/* g->q = d(grad)/d{x^n, v^n, gravity} of terms [from, to) times u, w and the direction in
 * gravity. */
static cloth_status clothi_tangent_terms(clothi_grad *g, const clothi_check *c, const cloth_eval *e,
                                         int from, int to, const double *u, const double *w) {
    cloth_sim   *s = g->s;
    const size_t n = g->t->nv3, bytes = n * sizeof(double);
    cloth_status status = CLOTH_OK;
    double       by[3];
    size_t       i, j;
    int          k;
    memset(g->a, 0, bytes);
    for (i = 0; i < n && !status; i++) {
        cloth_vjp row;
        memset(&row, 0, sizeof row);
        memset(g->np, 0, 2 * bytes);        /* and nw */
        memset(by, 0, sizeof by);
        row.x_n = g->np, row.v_n = g->nw, row.gravity = by;
        g->a[i] = 1;
        for (k = from; k < to && !status; k++)
            status = s->term[k].vjp(s->term[k].user, e, g->a, &row);
        g->a[i] = 0;
        for (j = 0, g->q[i] = 0; j < n; j++) g->q[i] += g->np[j] * u[j] + g->nw[j] * w[j];
        for (k = 0; k < 3; k++) g->q[i] += by[k] * clothi_check_dir(c->cause + 2, k);
    }
    return status;
}

/* Poses of attachments, d of them g->pose, of those that are points of x where the step begins x0:
 * forces by them. */
static void clothi_tangent_poses(clothi_grad *g) {
    const cloth_sim *s = g->s;
    const double     rest = 1 - s->in.share[1];
    double           p[3], w[6];
    int              i, j, n, v[6];
    for (i = 0; i < s->in.nattach; i++) {
        const cloth_step_attachment *a = s->in.attach + i;
        n = clothi_attach_gap(s->model, NULL, a, g->x0, v, w, p);
        if (n && clothi_grad_fresh(g, i)) memcpy(g->pose + 3 * i, p, sizeof p);
        for (j = 0; j < 3 * n; j++)
            g->q[3 * v[j / 3] + j % 3] -= rest * a->k * w[j / 3] * g->pose[3 * i + j % 3];
    }
}

/* dx, dv and those before over a substep of step k, whose start moves by g->x0. */
static cloth_status clothi_tangent_substep(clothi_grad *g, clothi_check *c, clothi_line *line,
                                           int k) {
    cloth_sim   *s = g->s;
    const size_t n = g->t->nv3;
    const int    touches = s->contact_on;
    cloth_status status = clothi_tangent_terms(g, c, &line->goal.e, 0, s->nterms, c->dx, c->dv);
    size_t       i;
    if (!status) clothi_tangent_poses(g);
    for (i = 0; i < n; i++)
        g->lv[i] = s->pin[i / 3] >> i % 3 & 1 && !(s->model->tie && s->model->tie[i] >= 0)
                       ? (1 - s->in.share[1]) * g->x0[i] : 0;
    memcpy(g->nx, g->lv, n * sizeof(double));
    clothi_tie_spread(s->model, g->nx);
    if (!status && touches)
        status = s->contact.jvp(s->contact.user, &line->goal.e, c->dx, g->nx, g->q);
    for (i = 0; i < n; i++) {
        const double dy = line->yx * c->dx[i] + line->yv * c->dv[i] + line->yp * c->dp[i] +
                          line->yw * c->dq[i];
        g->lx[i] = line->weight * s->params.mass[i / 3] * dy - g->q[i];
    }
    s->contact_on = 0;                      /* H of the rest, then with contact's model */
    if (!status) status = clothi_newton_assemble(s, &line->goal, 1);
    s->contact_on = touches;
    if (status) return status;
    clothi_tie_gradient(s->model, g->lx);
    cloth_matrix_mul(s->matrix, NULL, g->lv, g->q);
    for (i = 0; i < n; i++) g->lx[i] -= g->q[i];
    if (touches) status = clothi_newton_assemble(s, &line->goal, 1);
    if (!status) status = clothi_grad_solve(g, line, g->lx, g->z, k);
    for (i = 0; i < n; i++) g->z[i] += g->lv[i];
    clothi_tie_spread(s->model, g->z);
    if (!status && touches)
        status = s->contact.jvp(s->contact.user, &line->goal.e, c->dx, g->z, NULL);
    for (i = 0; i < n; i++) {
        const double dv = line->vx * g->z[i] + line->vn * c->dx[i] + line->vp * c->dp[i];
        c->dp[i] = c->dx[i], c->dq[i] = c->dv[i];
        c->dx[i] = g->z[i], c->dv[i] = dv;
    }
    return status;
}

/* A kick at x, v: dv. */
static cloth_status clothi_tangent_kick(clothi_grad *g, clothi_check *c, double hs, double kick,
                                        const double *x, const double *v) {
    cloth_sim   *s = g->s;
    const size_t n = g->t->nv3;
    cloth_eval   e, o;
    cloth_status status;
    const int    damped = clothi_leap_forces(g, hs, x, v, c->dx, g->lx, &e, &o, &status);
    size_t       i;
    for (i = 0; i < n; i++) g->lv[i] = c->dx[i] - hs * c->dv[i];
    if (!status && damped)
        status = clothi_tangent_terms(g, c, &e, 0, CLOTHI_TERM_BEND + 1, g->lv, c->dv);
    for (i = 0; i < n && damped; i++) g->lx[i] += g->q[i];
    if (!status)
        status = clothi_tangent_terms(g, c, &o, CLOTHI_TERM_FORCE, s->nterms, c->dx, c->dv);
    clothi_tangent_poses(g);
    for (i = 0; i < n; i++)
        if (!(s->pin[i / 3] >> i % 3 & 1))
            c->dv[i] += kick * (clothi_check_dir(c->cause + 2, (int)i % 3) -
                                (g->lx[i] + g->q[i]) / s->params.mass[i / 3]);
    return status;
}

/* The program on places (or speeds) at its result x: d of what it was given becomes that of x. */
static void clothi_tangent_rows(clothi_grad *g, clothi_rows *q, int speeds, const double *x,
                                double *d) {
    const cloth_sim *s = g->s;
    int              z, i, j, m, turn;
    for (z = 0; z < q->nzone; z++) {
        for (i = q->start[z], m = 0; i < q->start[z + 1]; i++)
            if (clothi_row_pushes(q->row + q->order[i], speeds)) q->list[m++] = q->order[i];
        for (turn = 0; turn < 2; turn++) {  /* M^-1 dG' lambda joins d; then M^-1 G' mu */
            for (i = 0; i < 12 * m; i++) {
                const int                r = q->list[i / 12], k = i % 3, l = i / 3 % 4;
                const cloth_contact_row *p = q->row + r;
                const double            *by = q->moved + CLOTH_ROW_RATES * r;
                const double turned = by[k] * p->w[l] + by[3 + l] * p->normal[k];
                const double lambda = speeds ? p->impulse : p->multiplier;
                if (!turn && i % 12 == 0) q->mu[r] = by[7 + speeds];
                if (l >= p->n || p->v[l] >= s->model->nv) continue;
                j = 3 * p->v[l] + k;
                if (!turn) q->mu[r] -= turned * x[j];
                if (!(s->pin[p->v[l]] >> k & 1))
                    d[j] += (turn ? q->mu[r] * p->w[l] * p->normal[k] : lambda * turned) /
                            s->params.mass[p->v[l]];
            }
            for (i = 0; i < m * !turn; i++)
                q->mu[q->list[i]] -= clothi_row_along(s, q->row + q->list[i], d, 0);
            if (!turn) clothi_rows_solve(g, q, m);
        }
    }
}

/* Contact at the end of a drift, as clothi_leap_touch; rows move by rows_vjp of unit vectors. */
static cloth_status clothi_tangent_touch(clothi_grad *g, clothi_check *c, double hs,
                                         const double *x, const double *next) {
    const size_t  n = g->t->nv3, bytes = n * sizeof(double);
    clothi_passes p = {0, NULL, NULL};
    clothi_rows   q;
    cloth_status  status;
    int           i, at, frozen;
    if (memcmp(x + 2 * n, next, 2 * bytes) == 0) return CLOTH_OK;
    memset(&q, 0, sizeof q);
    status = clothi_passes_open(g, hs, x, next, &p, &q, &frozen);
    if (!status) memcpy(p.d, c->dx, bytes);
    for (at = 1; at <= p.n && !status; at++) {          /* where passes began, then the end */
        double *d = at < p.n ? p.d + (size_t)at * n : c->dx;
        if (p.n > 1) status = clothi_leap_resolve(g, hs, x, at % p.n, &q);
        for (i = 0; i < CLOTH_ROW_RATES * q.n && !status; i++) {
            const cloth_contact_row *r = q.row + i / CLOTH_ROW_RATES;
            if (!(r->multiplier > 0)) continue;
            memset(g->lx, 0, bytes);
            memset(g->np, 0, bytes);
            q.rate[i] = 1;
            (void)clothi_rows_made(g, &q, &p, r->pass, g->lx);
            q.rate[i] = 0;
            q.moved[i] = clothi_grad_dot(g->lx, p.d + (size_t)r->pass * n, n) +
                         clothi_grad_dot(g->np, c->dp, n);
        }
        memcpy(d, p.d, bytes);
        if (!status) clothi_tangent_rows(g, &q, 0, g->s->w.x, d);
    }
    if (!status) clothi_tangent_rows(g, &q, 1, g->s->w.trial, c->dv);
    clothi_rows_close(g, &q);
    clothi_free(&g->t->hooks, p.x);
    return status;
}

/* Step k of LEAPFROG. */
static cloth_status clothi_tangent_leap(clothi_grad *g, clothi_check *c, int k) {
    cloth_sim    *s = g->s;
    const size_t  n = g->t->nv3, each = clothi_tape_each(g->t);
    const double  h = g->t->step[k].h;
    cloth_status  status = clothi_leap_path(g, k, g->t->step[k].slot);
    const int     m = g->t->traced - 1;
    int           j;
    size_t        i;
    for (j = 0; j <= m && !status; j++) {
        const double *x = g->t->trace + each * (size_t)j, hs = h / m;
        double        share;
        clothi_input(s, hs, (double)j / m, (double)(j + 1) / m);
        share = s->in.share[1];
        s->in.x = x, s->in.v = x + n, s->in.share[1] = s->in.share[0];
        for (i = 0; i < n; i++)
            if (s->pin[i / 3] >> i % 3 & 1) c->dv[i] = -s->fraction * g->x0[i] / h;
        status = clothi_tangent_kick(g, c, hs, j == 0 || j == m ? 0.5 * hs : hs, x, x + n);
        memcpy(c->dp, c->dx, n * sizeof(double));
        for (i = 0; i < n && j < m; i++)
            c->dx[i] = s->pin[i / 3] >> i % 3 & 1 ? (1 - share) * g->x0[i]
                                                  : c->dx[i] + hs * c->dv[i];
        s->in.share[1] = share;
        if (!status && s->contact_on && j < m)
            status = clothi_tangent_touch(g, c, hs, x, x + each);
    }
    if (s->contact_on) s->contact.rollback(s->contact.user, NULL);
    return status;
}

/* Sum of the weights times the tangent of all states, for x0, v0 and gravity at once. */
static cloth_status clothi_tangent_walk(clothi_grad *g, clothi_check *c) {
    cloth_tape  *t = g->t;
    cloth_sim   *s = g->s;
    const size_t n = t->nv3;
    cloth_status status = CLOTH_OK;
    clothi_line  line;
    int          k, i;
    for (i = 0; i < (int)n; i++) {
        c->dx[i] = clothi_check_dir(c->cause, i);
        c->dv[i] = clothi_check_dir(c->cause + 1, i);
    }
    clothi_check_weigh(c, 0, c->dx, c->dv);
    for (k = 0; k < t->n && !status; k++) {
        const clothi_taped  *e = t->step + k;
        const int            leap = s->model->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG;
        const int            m = leap || e->asleep ? 0 : e->substeps > 1 ? e->substeps : 1;
        const unsigned char *end = k + 1 < t->n ? t->step[k + 1].slot : t->end;
        const double *ends = (const double *)(const void *)(e->slot + t->motion);
        memcpy(g->x0, c->dx, n * sizeof(double));
        status = clothi_grad_put(g, k, e->slot);
        if (!status && leap && !e->asleep) status = clothi_tangent_leap(g, c, k);
        if (!status && m) status = clothi_keep(s);
        for (i = 0; i < m && !status; i++) {
            status = clothi_line_open(s, e, i, m, i < m - 1
                                                         ? ends + (size_t)i * n
                                                         : (const double *)(const void *)end,
                                      &line);
            if (!status) status = clothi_tangent_substep(g, c, &line, k);
            if (!status) status = clothi_line_close(s, &line);
        }
        if (e->slept) memset(c->dv, 0, n * sizeof(double));
        for (i = 0; i < 3 * s->model->desc.max_attachments; i++) g->pose[i] *= 1 - e->fraction;
        clothi_check_weigh(c, k + 1, c->dx, c->dv);
    }
    return status;
}

/* --- differences --- */

/* size: of each number's direction; below 0: times the number, where it is above 0; what is at its
 * bound, or a number that others make, stays. A cause of which nothing moves has no row. */
static void clothi_check_add(clothi_check *c, const char *name, double *at, int n, size_t stride,
                             double **g, double size, int host) {
    clothi_cause *q = c->cause + c->causes;
    int           i, moves = 0;
    q->name = name, q->at = at, q->n = n, q->stride = stride, q->host = host;
    q->size = c->block ? c->block + c->results + n : NULL;
    for (i = 0; i < n; i++) {
        const double a = *clothi_check_number(q, i);
        double       by = size < 0 ? -size * clothi_max(a, 0) : size;
        if (g == &c->g.poisson) by = clothi_min(by, 0.5 * clothi_min(0.5 - a, 1 + a));
        if (q->size) q->size[i] = by;
        moves |= by > 0;
    }
    if (!moves) return;
    if (c->block) *g = c->block + c->results;
    q->g = *g;
    c->results += 3 * (size_t)n;
    c->causes++;
}

/* What can be moved, x0, v0 and gravity first; results into c->block, where it is. */
static void clothi_check_causes(clothi_check *c) {
    cloth_sim      *s = c->s;
    cloth_params   *p = cloth_sim_params(s);
    cloth_material *m = p ? p->material : NULL;
    cloth_grad     *g = &c->g;
    const size_t    one = sizeof(double), all = sizeof *m;
    const int       n = 3 * s->model->nv, nr = s->model->nregions;
    c->causes = 0, c->results = 0;
    if (!p) return;
    clothi_check_add(c, "x0", s->state.x, n, one, &g->x0, 1e-3 * s->edge, 0);
    clothi_check_add(c, "v0", s->state.v, n, one, &g->v0, 1e-2, 0);
    clothi_check_add(c, "gravity", s->gravity, 3, one, &g->gravity, 0.1, 1);
    if (s->wind_on) clothi_check_add(c, "wind", s->wind, 3, one, &g->wind, 0.1, 1);
    clothi_check_add(c, "membrane", &m->membrane, nr, all, &g->membrane, -0.01, 1);
    if (s->model->membrane.kind == CLOTHI_TRIANGLE)
        clothi_check_add(c, "poisson", &m->poisson, nr, all, &g->poisson, 0.01, 1);
    clothi_check_add(c, "bending", &m->bending, nr, all, &g->bending, -0.01, 1);
    clothi_check_add(c, "damping", &m->damping, nr, all, &g->damping, -0.01, 1);
    if (!p->mass_given)
        clothi_check_add(c, "density", &m->density, nr, all, &g->density, -0.01, 1);
    else clothi_check_add(c, "mass", p->mass, p->nv, one, &g->mass, -0.01, 0);
    clothi_check_add(c, "X", p->X, 6 * p->nf, one, &g->X, 1e-3 * s->edge, 0);
    if (s->model->bend.kind == CLOTHI_HINGE)
        clothi_check_add(c, "theta0", p->theta0, p->nh, one, &g->theta0, 0.01, 0);
    if (p->nh)
        clothi_check_add(c, "hinge_scale", p->hinge_scale, p->nh, one, &g->hinge_scale, 0.01, 0);
}

/* The sim as it was saved, ready to run; moved by eps times the direction of q (NULL: not). */
static cloth_status clothi_check_start(clothi_check *c, const clothi_cause *q, double eps) {
    cloth_status status = cloth_sim_restore(c->s, c->start, c->size);
    if (status) return status;
    if (q) clothi_check_move(q, eps);
    status = cloth_sim_params_changed(c->s);
    cloth_sim_state_changed(c->s);
    if (c->s->contact_on && c->s->contact.adjoint)      /* x may be as it was: anchors go too */
        (void)c->s->contact.adjoint(c->s->contact.user, CLOTH_ADJOINT_FORGET, 0, NULL);
    return status;
}

/* Sum of weights along a run with q moved; *set: the run itself said what q is. */
static cloth_status clothi_check_value(clothi_check *c, const clothi_cause *q, double eps,
                                       int *set) {
    cloth_status status = clothi_check_start(c, q, eps);
    int          i;
    if (status) return status;
    c->sum = 0, c->k = 0;
    clothi_check_weigh(c, 0, c->s->state.x, c->s->state.v);
    for (i = 0; i < q->n; i++) q->size[q->n + i] = *clothi_check_number(q, i);
    status = c->run(c->s, c->run_user);
    for (i = 0; i < q->n && q->host; i++)
        *set |= memcmp(q->size + q->n + i, clothi_check_number(q, i), sizeof *q->size) != 0;
    if (!status && c->k != c->n)
        status = clothi_fail(&c->s->hooks, CLOTH_ERR_ARGUMENT, "cloth_grad_check: the run made %i "
                             "steps, then %i", c->n, c->k);
    return status;
}

/* One row; *set as above: it is none. */
static cloth_status clothi_check_row(clothi_check *c, const clothi_cause *q, cloth_check_row *row,
                                     int *set) {
    enum { N = CLOTHI_CHECK_LEVELS };
    double       d[N][N], turn[N][N], v[3], eps = 1, off, error = HUGE_VAL;
    cloth_status status;
    int          i, j;
    memset(row, 0, sizeof *row);
    row->cause = q->name;
    row->adjoint = clothi_check_along(q);
    *set = 0;
    status = clothi_check_value(c, q, 0, set);
    v[2] = c->sum;
    for (i = 0; i < N && !status && !*set; i++, eps *= 0.25) {
        double power = 16;
        status = clothi_check_value(c, q, eps, set);
        v[0] = c->sum;
        if (!status) status = clothi_check_value(c, q, -eps, set);
        v[1] = c->sum;
        d[i][0] = (v[0] - v[1]) / (2 * eps);
        turn[i][0] = ((v[0] - v[2]) + (v[1] - v[2])) / (2 * eps);
        for (j = 1; j <= i; j++, power *= 16) {
            d[i][j] = (power * d[i][j - 1] - d[i - 1][j - 1]) / (power - 1);
            turn[i][j] = (power / 4 * turn[i][j - 1] - turn[i - 1][j - 1]) / (power / 4 - 1);
            off = clothi_max(fabs(d[i][j] - d[i][j - 1]), fabs(d[i][j] - d[i - 1][j - 1]));
            off = clothi_max(off, fabs(turn[i][j]));
            if (off < error) error = off, row->other = d[i][j];
        }
    }
    off = clothi_max(fabs(row->adjoint), fabs(row->other));
    row->off = off > 0 ? fabs(row->adjoint - row->other) / off : 0;
    row->doubt = off > 0 ? error / off : 0;
    return status;
}

/* The run on a tape, its gradient, and the dot-product test, where it can be. */
static cloth_status clothi_check_adjoint(clothi_check *c, cloth_check_row *row, int *rows,
                                         cloth_grad_report *rep) {
    cloth_sim     *s = c->s;
    const size_t   n = 3 * (size_t)s->model->nv;
    cloth_tape    *tape = NULL;
    unsigned char *block = NULL;
    clothi_grad    g;
    cloth_grad_report local;
    cloth_status   status = clothi_check_start(c, NULL, 0);
    int            k, walks;
    if (!status) status = cloth_tape_create(s, NULL, &tape);
    if (!status) status = c->run(s, c->run_user);
    if (!status && tape->ended) status = tape->ended_by;            /* it has said why */
    c->n = cloth_tape_steps(tape);
    if (!status) {
        c->w = (double *)clothi_alloc(&s->hooks, 2 * n * (size_t)(c->n + 1), sizeof(double));
        status = c->w ? cloth_grad_backward(tape, clothi_check_loss, c, &c->g, rep)
                      : CLOTH_ERR_MEMORY;
    }
    if (!status && s->contact_on) {         /* J is ill-conditioned: solved to rounding */
        tape->opt.tolerance = 1e-14;
        status = cloth_grad_backward(tape, clothi_check_loss, c, &c->g, &local);
    }
    walks = !status && (!s->contact_on || s->contact.jvp);
    for (k = 0; walks && k < c->n; k++) walks = tape->step[k].h > 0;
    if (walks) {
        memset(&local, 0, sizeof local);
        status = clothi_grad_open(&g, tape, &c->g, &local, &block);
        tape->mode = CLOTHI_TAPE_DEAF;
        c->sum = 0;
        g.forwards = 1;
        if (!status) status = clothi_tangent_walk(&g, c);
        tape->mode = CLOTHI_TAPE_RECORD;
        clothi_grad_close(&g, block);
        memset(row, 0, sizeof *row);
        row->cause = "dot product";
        for (k = 0; k < 3; k++) row->adjoint += clothi_check_along(c->cause + k);
        row->other = c->sum;
        row->off = fabs(row->adjoint - row->other) /
                   clothi_max(clothi_max(fabs(row->adjoint), fabs(row->other)), 1e-300);
        *rows = 1;
    }
    cloth_tape_destroy(tape);
    return status;
}

CLOTH_API cloth_status cloth_grad_check(cloth_sim *sim, cloth_run_fn *run, void *run_user,
                                        cloth_loss_fn *loss, void *user,
                                        cloth_check_row *row, int *rows, cloth_grad_report *rep) {
    cloth_recorder    host, ours;
    cloth_grad_report local;
    clothi_check      c;
    cloth_status      status;
    size_t            n;
    int               i, set;
    if (rows) *rows = 0;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!run || !loss || !row || !rows)
        return clothi_null(&sim->hooks, "cloth_grad_check: run, loss, row or rows");
    if (sim->tape_gone)
        return clothi_fail(&sim->hooks, CLOTH_ERR_ARGUMENT, "cloth_grad_check: this sim has a tape "
                           "already");
    memset(&c, 0, sizeof c);
    c.s = sim, c.loss = loss, c.user = user, c.run = run, c.run_user = run_user;
    n = 3 * (size_t)sim->model->nv;
    clothi_check_causes(&c);
    c.size = cloth_sim_save_size(sim);
    c.start = clothi_alloc(&sim->hooks, c.size, 1);
    c.dx = (double *)clothi_alloc(&sim->hooks, 4 * n + c.results, sizeof(double));
    host = sim->recorder;
    status = c.start && c.dx && c.causes ? cloth_sim_save(sim, c.start, c.size) : CLOTH_ERR_MEMORY;
    if (!status) {
        c.dv = c.dx + n, c.dp = c.dv + n, c.dq = c.dp + n, c.block = c.dq + n;
        clothi_check_causes(&c);
        memset(&sim->recorder, 0, sizeof host);
        status = clothi_check_adjoint(&c, row, rows, rep ? rep : &local);
        memset(&ours, 0, sizeof ours);
        ours.user = &c, ours.step = clothi_check_heard;
        sim->recorder = ours;
        for (i = 0; i < c.causes && !status; i++) {
            status = clothi_check_row(&c, c.cause + i, row + *rows, &set);
            *rows += !status && !set;
        }
        sim->recorder = host;
        if (cloth_sim_restore(sim, c.start, c.size) && !status) status = CLOTH_ERR_MEMORY;
    }
    clothi_free(&sim->hooks, c.w);
    clothi_free(&sim->hooks, c.dx);
    clothi_free(&sim->hooks, c.start);
    return status;
}

CLOTHI_RARE_END

/* ===== [6.1] TARGETS, NEAREST POINTS =========================================================
 *
 *   target i       L = beta w |d|^2, d = sum_k b_k x_k - target;   dL/dx_k = 2 beta w b_k d
 *
 *   nearest point  of p, r_i = p - x_i, e_i from corner i to the next, n the normal: the nearest of
 *                  x_i + t e_i, t = r_i.e_i/|e_i|^2 in [0, 1], and, where all (e_i x r_i).n >= 0,
 *                  the point inside with these over their sum as b of the corner across side i,
 *                  where it is nearer (in a needle n is rounding)
 * checked: tests/test_loss.c: targets, nearest_triangle, nearest_mesh
 */

CLOTH_API cloth_targets cloth_targets_default(void) {
    cloth_targets q;
    memset(&q, 0, sizeof q);
    q.beta = CLOTH_DEFAULT_BETA_ATTACH;
    return q;
}

/* Rows of 3 numbers that must be there and finite; call names who asks and what they are. */
static cloth_status clothi_rows_check(const cloth_hooks *hooks, const char *call, const double *a,
                                      size_t rows) {
    const ptrdiff_t at = a ? clothi_find_nonfinite(a, 3 * rows) : -1;
    if (!a && rows > 0) return clothi_null(hooks, call);
    if (at < 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "%s: row %i is NaN or infinite", call,
                       (int)(at / 3));
}

/* Indices that must be in [low, high). */
static cloth_status clothi_index_check(const cloth_hooks *hooks, const char *call, const int *list,
                                       size_t n, int low, int high) {
    size_t i;
    if (!list && n > 0) return clothi_null(hooks, call);
    for (i = 0; i < n; i++)
        if (list[i] < low || list[i] >= high)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "%s: entry %i is %i, not in [%i, %i)",
                               call, (int)i, list[i], low, high);
    return CLOTH_OK;
}

/* A factor that must be finite and at least 0. */
static cloth_status clothi_factor_check(const cloth_hooks *hooks, const char *call, double w) {
    if (clothi_finite(w) && w >= 0) return CLOTH_OK;
    return clothi_fail(hooks, w < 0 ? CLOTH_ERR_ARGUMENT : CLOTH_ERR_NONFINITE,
                       "%s = %g must be finite and at least 0", call, w);
}

/* Target i: corners v [3] of its point, their weights b [3], d [3]; returns w, 0: not looked at. */
static double clothi_target(const cloth_targets *q, int i, const double *x, int *v, double *b,
                            double *d) {
    const size_t at = 3 * (size_t)i;
    int          k;
    if (q->faces && q->face[i] < 0) return 0;
    for (k = 0; k < 9; k++) {
        const int j = k / 3, c = k % 3;
        v[j] = q->faces ? q->faces[3 * (size_t)q->face[i] + (size_t)j] : i;
        b[j] = q->faces ? q->bary[at + (size_t)j] : j == 0;
        d[c] = (j ? d[c] : -q->target[at + (size_t)c]) + b[j] * x[3 * (size_t)v[j] + (size_t)c];
    }
    return q->weight ? q->weight[i] : 1;
}

static cloth_status clothi_targets_check(const cloth_targets *q, const double *x) {
    const size_t faces = q->faces ? 3 * (size_t)q->nf : 0, n = q->faces ? (size_t)q->n : 0;
    cloth_status status;
    if (!x || (q->n > 0 && !(q->target && (q->bary || !q->faces))))
        return clothi_null(q->hooks, "cloth_loss_targets: x, or target or bary of targets");
    if (q->nv < 0 || q->nf < 0 || q->n < 0 || (!q->faces && q->n != q->nv))
        return clothi_fail(q->hooks, CLOTH_ERR_ARGUMENT, "cloth_loss_targets: nv = %i, nf = %i, "
                           "n = %i (without faces nv)", q->nv, q->nf, q->n);
    status = clothi_factor_check(q->hooks, "cloth_loss_targets: beta", q->beta);
    if (!status)
        status = clothi_index_check(q->hooks, "cloth_loss_targets: faces", q->faces, faces, 0,
                                    q->nv);
    return status ? status : clothi_index_check(q->hooks, "cloth_loss_targets: face", q->face, n,
                                                -1, q->nf);
}

CLOTH_API cloth_status cloth_loss_targets(const cloth_targets *q, const double *x, double *loss,
                                          double *g_x) {
    cloth_status status;
    double       sum = 0, b[3], d[3];
    int          i, k, v[3];
    if (!q) return CLOTH_ERR_ARGUMENT;
    status = clothi_targets_check(q, x);
    for (i = 0; i < q->n && !status; i++) {
        const double w = clothi_target(q, i, x, v, b, d), by = q->beta * w;
        if (w >= 0 && by <= 0) continue;
        sum += by * clothi_dot3(d, d);
        if (w < 0 || !clothi_finite(sum))
            status = clothi_fail(q->hooks, w < 0 ? CLOTH_ERR_ARGUMENT : CLOTH_ERR_NONFINITE,
                                 "cloth_loss_targets: weight %g, or x, bary or target of target %i "
                                 "is not finite", w, i);
    }
    if (!status && loss) *loss += sum;
    for (i = 0; i < q->n && !status && g_x; i++) {
        const double w = 2 * q->beta * clothi_target(q, i, x, v, b, d);
        for (k = 0; k < 9 && w > 0; k++)
            g_x[3 * (size_t)v[k / 3] + (size_t)(k % 3)] += w * b[k / 3] * d[k % 3];
    }
    return status;
}

CLOTH_API double cloth_nearest_on_triangle(const double *p, const double *x, double *bary) {
    double r[9], e[3], n[3], c[3], in[3], best = HUGE_VAL, sum;
    int    i, k;
    for (i = 0; i < 9; i++) r[i] = p[i % 3] - x[i];
    bary[0] = 1, bary[1] = bary[2] = 0;
    clothi_sub3(r, r + 3, e);
    clothi_sub3(r, r + 6, c);
    clothi_cross3(e, c, n);
    for (i = 0; i < 3; i++) {
        const int j = i < 2 ? i + 1 : 0;
        double    ee, re, t;
        clothi_sub3(r + 3 * i, r + 3 * j, e);
        clothi_cross3(e, r + 3 * i, c);
        in[3 - i - j] = clothi_dot3(c, n);
        ee = clothi_dot3(e, e), re = clothi_dot3(r + 3 * i, e);
        t = !(re > 0) ? 0 : re < ee ? re / ee : 1;
        for (k = 0; k < 3; k++) c[k] = r[3 * i + k] - t * e[k];
        if (!(clothi_dot3(c, c) < best)) continue;
        best = clothi_dot3(c, c);
        bary[i] = 1 - t, bary[j] = t, bary[3 - i - j] = 0;
    }
    sum = in[0] + in[1] + in[2];
    if (!(in[0] >= 0 && in[1] >= 0 && in[2] >= 0 && sum > 0)) return best;
    for (k = 0; k < 3; k++) c[k] = (in[0] * r[k] + in[1] * r[3 + k] + in[2] * r[6 + k]) / sum;
    if (!(clothi_dot3(c, c) < best)) return best;
    for (i = 0; i < 3; i++) bary[i] = in[i] / sum;
    return clothi_dot3(c, c);
}

/* Squared distance of p from the box of the triangle x [3 x 3]. */
static double clothi_box_distance2(const double *p, const double *x) {
    double sum = 0;
    int    k;
    for (k = 0; k < 3; k++) {
        const double low = clothi_min(x[k], clothi_min(x[3 + k], x[6 + k])) - p[k];
        const double high = p[k] - clothi_max(x[k], clothi_max(x[3 + k], x[6 + k]));
        sum += low > 0 ? low * low : high > 0 ? high * high : 0;
    }
    return sum;
}

CLOTH_API cloth_status cloth_nearest_on_mesh(const cloth_hooks *hooks, int nv, const double *x,
                                             int nf, const int *faces, int n, const double *point,
                                             double most, int *face, double *bary) {
    cloth_status status;
    double       y[9], b[3], best, d2;
    int          i, f, k;
    if (n > 0 && (!face || !bary))
        return clothi_null(hooks, "cloth_nearest_on_mesh: face or bary");
    if (nv < 0 || nf < 0 || n < 0 || !(most >= 0))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_nearest_on_mesh: nv = %i, nf = %i, "
                           "n = %i, most = %g must be at least 0", nv, nf, n, most);
    status = clothi_rows_check(hooks, "cloth_nearest_on_mesh: x", x, (size_t)nv);
    if (!status)
        status = clothi_rows_check(hooks, "cloth_nearest_on_mesh: point", point, (size_t)n);
    if (!status)
        status = clothi_index_check(hooks, "cloth_nearest_on_mesh: faces", faces, 3 * (size_t)nf, 0,
                                    nv);
    for (i = 0; i < n && !status; i++) {
        const double *p = point + 3 * (size_t)i;
        face[i] = -1;
        memset(bary + 3 * (size_t)i, 0, sizeof b);
        for (f = 0, best = most * most; f < nf; f++) {
            for (k = 0; k < 3; k++)
                memcpy(y + 3 * k, x + 3 * (size_t)faces[3 * (size_t)f + (size_t)k], 3 * sizeof *y);
            if (clothi_box_distance2(p, y) > best) continue;
            d2 = cloth_nearest_on_triangle(p, y, b);
            if (d2 > best || (face[i] >= 0 && !(d2 < best))) continue;
            best = d2;
            face[i] = f;
            memcpy(bary + 3 * (size_t)i, b, sizeof b);
        }
    }
    return status;
}

CLOTHI_RARE_BEGIN

/* ===== [6.2] FRAMES, SIMULATED ===============================================================
 *
 *      x_0 ---- x_1 ---- x_2 ---- x_3 ---- x_4      predictions
 *       |  v            failed     |  v
 *       +------> y_1 --> :         +-----> y_4      simulated; a tape for each run of steps
 *
 *   A run from frame i, v = (x_(a+1) - x_a)/h, a = i (backward: i - 1), ends with the last frame or
 *   before the first that fails. With gx, gv = dL/d{x, v} at its start by the adjoint:
 *       dL/dx_i += gx,   dL/dx_(a+1) += gv/h,   dL/dx_a -= gv/h,
 *       dL/dx_k += -2 beta/nv (y_k - x_k) for each frame k that it reached
 * checked: tests/test_loss.c: layer_*
 */

#define CLOTHI_LAYER_COOKIE 0x7a9e0011u

typedef struct clothi_layer {               /* one call                                        */
    const cloth_layer  *o;
    cloth_sim          *s;
    cloth_layer_report *r;
    void               *home;               /* [size] the sim as it was                        */
    size_t              size, n;            /* n = 3 nv                                        */
    double              t, loss;            /* t: s, of the sim as it was                      */
    double             *g, *gx, *gv;        /* [F x n], NULL: not wanted; [n], [n]             */
    const cloth_tape   *tape;               /* of the run under way, or NULL                   */
    double             *used;               /* [F] not 0: y_k is compared, after so many steps of
                                               its run                                         */
    size_t              a;                  /* n times the first frame of the run's difference */
    int                 from;               /* frame where the run begins                      */
} clothi_layer;

CLOTH_API cloth_layer cloth_layer_default(void) {
    cloth_layer o;
    memset(&o, 0, sizeof o);
    o.cookie = CLOTHI_LAYER_COOKIE, o.frames = CLOTH_DEFAULT_FRAMES;
    o.beta = CLOTH_DEFAULT_BETA_SIM, o.most = CLOTH_DEFAULT_SIM_MOST;
    return o;
}

static cloth_status clothi_layer_check(const cloth_sim *s, const cloth_layer *o) {
    const cloth_hooks *hooks = &s->hooks;
    cloth_status       status;
    if (o->cookie != CLOTHI_LAYER_COOKIE)
        return clothi_fail(hooks, CLOTH_ERR_UNINIT, "cloth_layer: not by cloth_layer_default()");
    if (s->tape_gone)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_layer_loss: this sim has a tape");
    if (o->frames < 2 + (o->backward != 0) || !clothi_finite(o->h) || !(o->h > 0) || !(o->most > 0))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_layer: frames = %i (2, backward 3, or "
                           "more), h = %g, most = %g (> 0)", o->frames, o->h, o->most);
    status = clothi_factor_check(hooks, "cloth_layer: beta", o->beta);
    if (!status)
        status = clothi_rows_check(hooks, "cloth_layer: x, frames one after the other,", o->x,
                                   (size_t)o->frames * (size_t)s->model->nv);
    return !status && o->tape ? clothi_tape_check(hooks, o->tape) : status;
}

/* The sim as it was, but at frame l->from. */
static cloth_status clothi_layer_start(const clothi_layer *l) {
    const cloth_layer *o = l->o;
    const double      *a = o->x + l->a;
    cloth_status       status = cloth_sim_restore(l->s, l->home, l->size);
    size_t             i;
    if (status) return status;
    memcpy(l->s->state.x, o->x + (size_t)l->from * l->n, l->n * sizeof(double));
    for (i = 0; i < l->n; i++) l->s->state.v[i] = (a[l->n + i] - a[i]) / o->h;
    l->s->state.t = l->t + l->from * o->h;
    cloth_sim_state_changed(l->s);
    return o->place ? o->place(l->s, l->from, 1, o->user) : CLOTH_OK;
}

/* A step to frame k; compared, where it is near enough. */
static cloth_status clothi_layer_step(clothi_layer *l, int k) {
    const cloth_layer *o = l->o;
    const double      *x = o->x + (size_t)k * l->n, *y = l->s->state.x;
    cloth_status       status = o->place ? o->place(l->s, k, 0, o->user) : CLOTH_OK;
    double             d2 = 0, t = l->s->state.t;
    size_t             i;
    if (!status)
        status = o->step ? o->step(l->s, o->h, o->user) : cloth_step(l->s, o->h, NULL);
    if (!status && !(l->s->state.t > t))
        status = clothi_fail(&l->s->hooks, CLOTH_ERR_ARGUMENT, "cloth_layer_loss: step() made none "
                             "to frame %i", k);
    if (status) return status;
    for (i = 0; i < l->n; i++) d2 += (y[i] - x[i]) * (y[i] - x[i]);
    d2 /= (double)(l->n / 3);
    if (!(sqrt(d2) <= o->most)) return CLOTH_OK;
    l->used[k] = l->tape ? cloth_tape_steps(l->tape) : 1;
    l->r->used++;
    l->r->worst = clothi_max(l->r->worst, sqrt(d2));
    l->loss += o->beta * d2;
    if (o->y) memcpy(o->y + (size_t)k * l->n, y, l->n * sizeof(double));
    return CLOTH_OK;
}

/* The frame to which step k > 0 of a run leads. */
static int clothi_layer_frame(const clothi_layer *l, int k) {
    int frame = l->from + 1;
    while (frame < l->o->frames - 1 && l->used[frame] > 0 && l->used[frame] < k) frame++;
    return frame;
}

/* The loss of step k of a run, a cloth_loss_fn: by y here, by the frame to l->g. */
static void clothi_layer_adds(int k, const double *x, const double *v, double *gx, double *gv,
                              void *user) {
    clothi_layer *l = (clothi_layer *)user;
    const int     frame = clothi_layer_frame(l, k);
    const size_t  at = (size_t)frame * l->n;
    const double  scale = 2 * l->o->beta / (double)(l->n / 3);
    size_t        i;
    (void)v, (void)gv;
    if (k == 0 || (int)l->used[frame] != k) return;
    for (i = 0; i < l->n; i++) {
        const double d = scale * (x[i] - l->o->x[at + i]);
        gx[i] += d;
        l->g[at + i] -= d;
    }
}

/* The report of a run to that of all. */
static void clothi_layer_merge(const clothi_layer *l, const cloth_grad_report *q) {
    cloth_grad_report *to = &l->r->grad;
    if (q->doubt && !to->doubt) to->step = clothi_layer_frame(l, q->step + 1);
    to->status = q->status, to->doubt |= q->doubt, to->valid = !to->status && !to->doubt;
    to->why = clothi_grad_why(to->doubt);
    to->steps += q->steps, to->replayed += q->replayed, to->negative += q->negative;
    to->solves += q->solves, to->iterations += q->iterations;
    to->factorizations += q->factorizations, to->early += q->early, to->ms += q->ms;
    to->residual = clothi_max(to->residual, q->residual);
    to->left_m = clothi_max(to->left_m, q->left_m);
    to->bytes = clothi_max_size(to->bytes, q->bytes);
    to->rows += q->rows, to->redundant += q->redundant;
    to->margin = clothi_min(to->margin, q->margin);
}

/* The run on the tape backwards, into l->g. */
static cloth_status clothi_layer_back(clothi_layer *l, cloth_tape *tape) {
    const size_t      at = (size_t)l->from * l->n;
    cloth_grad        out;
    cloth_grad_report q;
    cloth_status      status;
    size_t            i;
    memset(&out, 0, sizeof out);
    out.x0 = l->gx, out.v0 = l->gv;
    status = cloth_grad_backward(tape, clothi_layer_adds, l, &out, &q);
    clothi_layer_merge(l, &q);
    for (i = 0; i < l->n; i++) {
        const double by_v = l->gv[i] / l->o->h;
        l->g[at + i] += l->gx[i];
        l->g[l->a + i] -= by_v;
        l->g[l->a + l->n + i] += by_v;
    }
    return status;
}

/* From frame *at to the last one or to one that fails, which *at is then. */
static cloth_status clothi_layer_run(clothi_layer *l, int *at) {
    cloth_layer_report *r = l->r;
    cloth_tape         *tape = NULL;
    cloth_status        status;
    int                 k;
    l->from = *at;
    l->a = (size_t)(*at - (l->o->backward != 0)) * l->n;
    r->starts++;
    status = clothi_layer_start(l);
    if (!status && l->g) status = cloth_tape_create(l->s, l->o->tape, &tape);
    l->tape = tape;
    for (k = l->from + 1; k < l->o->frames && !status; k++) {
        status = clothi_layer_step(l, k);
        if (!status && tape && tape->ended)
            status = clothi_fail(&l->s->hooks, tape->ended_by, "cloth_layer_loss: the tape ends "
                                 "before frame %i: %s", k, tape->ended);
        if (status || !(l->used[k] > 0)) break;
    }
    if (k < l->o->frames && (!status || status == CLOTH_ERR_STEP || status == CLOTH_ERR_MESH ||
                             status == CLOTH_ERR_NONFINITE || status == CLOTH_ERR_NUMERIC)) {
        if (r->first_failed < 0) r->first_failed = k, r->failure = status;
        r->failed++;
        r->beyond += !status;
        status = CLOTH_OK;
    }
    if (!status && tape && l->used[l->from + 1] > 0) status = clothi_layer_back(l, tape);
    cloth_tape_destroy(tape);
    *at = k;
    return status;
}

CLOTH_API cloth_status cloth_layer_loss(cloth_sim *sim, const cloth_layer *layer, double *loss,
                                        double *g_x, cloth_layer_report *rep) {
    cloth_layer_report local, *r = rep ? rep : &local;
    cloth_recorder     host;
    clothi_layer       l;
    cloth_status       status;
    double            *block = NULL;
    size_t             i, all;
    int                at;
    memset(r, 0, sizeof *r);
    r->status = CLOTH_ERR_ARGUMENT, r->grad.why = "";
    r->first_failed = r->grad.step = -1, r->grad.margin = HUGE_VAL;
    if (!sim) return CLOTH_ERR_ARGUMENT;
    if (!layer) return clothi_null(&sim->hooks, "cloth_layer_loss: layer");
    r->status = clothi_layer_check(sim, layer);
    if (r->status) return r->status;
    memset(&l, 0, sizeof l);
    l.o = layer, l.s = sim, l.r = r, l.t = sim->state.t, l.n = 3 * (size_t)sim->model->nv;
    all = (size_t)layer->frames * l.n;
    l.size = cloth_sim_save_size(sim);
    l.home = clothi_alloc(&sim->hooks, l.size, 1);
    block = (double *)clothi_alloc(&sim->hooks, (size_t)layer->frames + (g_x ? all + 2 * l.n : 0),
                                   sizeof(double));
    r->status = l.home && block ? cloth_sim_save(sim, l.home, l.size) : CLOTH_ERR_MEMORY;
    if (!r->status) {
        l.used = block;
        if (g_x) l.g = block + layer->frames, l.gx = l.g + all, l.gv = l.gx + l.n;
        if (layer->y) memcpy(layer->y, layer->x, all * sizeof(double));
        host = sim->recorder;
        memset(&sim->recorder, 0, sizeof host);
        for (at = layer->backward != 0; at < layer->frames - 1 && !r->status;)
            r->status = clothi_layer_run(&l, &at);
        sim->recorder = host;
        status = cloth_sim_restore(sim, l.home, l.size);    /* _FORMAT: place() added, removed */
        if (status) r->status = status == CLOTH_ERR_FORMAT ? CLOTH_ERR_ARGUMENT : status;
    }
    r->grad.valid = g_x && !r->status && !r->grad.doubt;
    if (!r->status && loss) *loss += l.loss;
    for (i = 0; !r->status && g_x && i < all; i++) g_x[i] += l.g[i];
    clothi_free(&sim->hooks, block);
    clothi_free(&sim->hooks, l.home);
    return r->status;
}

CLOTHI_RARE_END

/* ===== [6.3] A GRAPH THAT CARRIES A MESH =====================================================
 *
 *   R a = a + s r x a + c r x (r x a),     q = r.r:
 *       s = sin|r|/|r| = 1 - q e,   c = (1 - cos|r|)/q,   e = (|r| - sin|r|)/|r|^3
 *   d(R a) = (J dr) x (R a),   J = 1 + c [r]x + e [r]x^2, its transpose with -c
 *
 *   So forces f at arms y = R a do J' sum y x f to r: one J' a node. Near 0 c and e come from their
 *   series, 1/2 - q/24 + .. and 1/6 - q/120 + ..
 * checked: tests/test_loss.c: graph_*
 */

typedef struct clothi_graph_turn {          /* the rotation of a node                          */
    double r[3], s, c, e;
} clothi_graph_turn;

static clothi_graph_turn clothi_graph_rotation(const double *r) {
    const double      q = clothi_dot3(r, r), l = sqrt(q);
    clothi_graph_turn t;
    memcpy(t.r, r, sizeof t.r);
    if (q < 0.25) {
        t.c = 0.5 - q / 24 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90 * (1 - q / 132))));
        t.e = 1.0 / 6 - q / 120 * (1 - q / 42 * (1 - q / 72 * (1 - q / 110 * (1 - q / 156))));
        t.s = 1 - q * t.e;
    } else {
        clothi_circle(l / (2 * CLOTHI_PI), &t.c, &t.s);
        t.s = t.s / l;
        t.c = (1 - t.c) / q;
        t.e = (1 - t.s) / q;
    }
    return t;
}

/* out = a + s r x a + c r x (r x a): R a. */
static void clothi_graph_twist(const double *r, double s, double c, const double *a, double *out) {
    double p[3], q[3];
    int    k;
    clothi_cross3(r, a, p);
    clothi_cross3(r, p, q);
    for (k = 0; k < 3; k++) out[k] = a[k] + s * p[k] + c * q[k];
}

/* What a moment and a force do to a node's (r, t) is added to g [6]. */
static void clothi_graph_push(const clothi_graph_turn *t, const double *moment, const double *force,
                              double *g) {
    double by[3];
    int    k;
    clothi_graph_twist(t->r, -t->c, t->e, moment, by);
    for (k = 0; k < 3; k++) g[k] += by[k], g[3 + k] += force[k];
}

typedef struct clothi_graph_maker {
    cloth_graph  *g;
    const double *X;
    int           k;
    double       *away2;                    /* [nv] m^2, to the nearest node so far            */
    double       *best2, *w;                /* [k + 1] m^2, sorted; [nv x k]                   */
    int          *mark, *best, *of;         /* [nn], [k + 1], [nv x k] nodes                   */
} clothi_graph_maker;

static double clothi_graph_apart2(const clothi_graph_maker *m, int v, int node) {
    return clothi_apart2(m->X + 3 * (size_t)v, m->g->g + 3 * (size_t)node, 1);
}

/* Nodes at farthest points from vertex `at` on; returns how many places there are, at most nn. */
static int clothi_graph_nodes(const clothi_graph_maker *m, int at) {
    int i, j;
    for (i = 0; i < m->g->nv; i++) m->away2[i] = HUGE_VAL;
    for (j = 0; j < m->g->nn && m->away2[at] > 0; j++) {
        memcpy(m->g->g + 3 * j, m->X + 3 * (size_t)at, 3 * sizeof(double));
        for (i = 0; i < m->g->nv; i++)
            m->away2[i] = clothi_min(m->away2[i], clothi_graph_apart2(m, i, j));
        for (i = 0, at = 0; i < m->g->nv; i++) at = m->away2[i] > m->away2[at] ? i : at;
    }
    return j;
}

/* The k nodes of vertex v and their weights. */
static void clothi_graph_bind(const clothi_graph_maker *m, int v) {
    double *w = m->w + (size_t)v * (size_t)m->k, sum = 0, most;
    int     i, j, n = 0;
    for (j = 0; j < m->g->nn; j++) {
        const double d2 = clothi_graph_apart2(m, v, j);
        if (n > m->k && !(d2 < m->best2[m->k])) continue;
        for (i = n > m->k ? m->k : n++; i > 0 && d2 < m->best2[i - 1]; i--)
            m->best2[i] = m->best2[i - 1], m->best[i] = m->best[i - 1];
        m->best2[i] = d2, m->best[i] = j;
    }
    most = n > m->k ? sqrt(m->best2[m->k]) : 2 * sqrt(m->best2[m->k - 1]);
    for (i = 0; i < m->k; i++) {
        w[i] = most > 0 ? 1 - sqrt(m->best2[i]) / most : 1;
        sum += w[i] *= w[i];
        m->of[(size_t)v * (size_t)m->k + (size_t)i] = m->best[i];
        m->g->start[m->best[i] + 1]++;
    }
    for (i = 0; i < m->k; i++) w[i] = sum > 0 ? w[i] / sum : 1.0 / m->k;
}

/* From lists by vertex to lists by node. */
static void clothi_graph_lists(const clothi_graph_maker *m) {
    cloth_graph *g = m->g;
    int          i, j;
    for (j = 0; j < g->nn; j++) g->start[j + 1] += g->start[j], m->mark[j] = g->start[j];
    for (i = 0; i < g->nv * m->k; i++) {
        j = m->mark[m->of[i]]++;
        g->vertex[j] = i / m->k;
        g->weight[j] = m->w[i];
    }
}

/* Pairs of nodes that share a vertex, into g->edge (NULL: counted). */
static void clothi_graph_pairs(const clothi_graph_maker *m) {
    cloth_graph *g = m->g;
    int          a, i, j, at, first, *edge = g->edge;
    for (a = 0, g->nedge = 0; a < g->nn; a++) m->mark[a] = -1;
    for (a = 0; a < g->nn; a++)
        for (i = g->start[a], first = g->nedge; i < g->start[a + 1]; i++)
            for (j = 0; j < m->k; j++) {
                const int b = m->of[g->vertex[i] * m->k + j];
                if (b <= a || m->mark[b] == a) continue;
                m->mark[b] = a;
                for (at = g->nedge++; edge && at > first && edge[2 * at - 1] > b; at--)
                    edge[2 * at + 1] = edge[2 * at - 1];
                if (edge) edge[2 * at + 1] = b, edge[2 * g->nedge - 2] = a;
            }
}

CLOTH_API cloth_status cloth_graph_create(const cloth_hooks *hooks, int nv, const double *X, int nn,
                                          int k, int first, cloth_graph **out) {
    clothi_graph_maker m;
    cloth_graph       *g;
    cloth_status       status;
    size_t             bound;
    int                i;
    if (!out) return clothi_null(hooks, "cloth_graph_create: out");
    *out = NULL;
    if (k < 1 || nn < k || nv < nn || k > CLOTH_MAX_COUNT / nv || first < 0 || first >= nv)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_graph_create: nv = %i, nn = %i <= nv, "
                           "k = %i <= nn, first = %i or nv k out of range", nv, nn, k, first);
    status = clothi_rows_check(hooks, "cloth_graph_create: X", X, (size_t)nv);
    if (status) return status;
    bound = (size_t)nv * (size_t)k;
    m.X = X, m.k = k, m.g = g = (cloth_graph *)clothi_alloc(hooks, 1, sizeof *g);
    m.away2 = (double *)clothi_alloc(hooks, (size_t)(nv + k + 1) + bound, sizeof(double));
    m.mark = (int *)clothi_alloc(hooks, (size_t)(nn + k + 1) + bound, sizeof(int));
    if (g) g->g = (double *)clothi_alloc(hooks, 3 * (size_t)nn + bound, sizeof(double));
    if (g) g->start = (int *)clothi_alloc(hooks, (size_t)nn + 1 + bound, sizeof(int));
    status = g && m.away2 && m.mark && g->g && g->start ? CLOTH_OK : CLOTH_ERR_MEMORY;
    if (!status) {
        m.best2 = m.away2 + nv, m.w = m.best2 + k + 1, m.best = m.mark + nn, m.of = m.best + k + 1;
        g->nv = nv, g->nn = nn, g->weight = g->g + 3 * nn, g->vertex = g->start + nn + 1;
        i = clothi_graph_nodes(&m, first);
        if (i < nn)
            status = clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "cloth_graph_create: %i places", i);
    }
    for (i = 0; i < nv && !status; i++) clothi_graph_bind(&m, i);
    if (!status) {
        clothi_graph_lists(&m);
        clothi_graph_pairs(&m);
        g->edge = (int *)clothi_alloc(hooks, 2 * (size_t)g->nedge + 1, sizeof(int));
        if (g->edge) clothi_graph_pairs(&m);
        else status = CLOTH_ERR_MEMORY;
    }
    if (status) cloth_graph_destroy(hooks, g);
    else *out = g;
    clothi_free(hooks, m.mark);
    clothi_free(hooks, m.away2);
    return status;
}

CLOTH_API void cloth_graph_destroy(const cloth_hooks *hooks, cloth_graph *graph) {
    if (!graph) return;
    clothi_free(hooks, graph->g);
    clothi_free(hooks, graph->start);
    clothi_free(hooks, graph->edge);
    clothi_free(hooks, graph);
}

static cloth_status clothi_graph_check(const cloth_hooks *hooks, const cloth_graph *g,
                                       const double *p) {
    cloth_status status;
    int          j;
    if (!g) return clothi_null(hooks, "a cloth_graph");
    status = clothi_rows_check(hooks, "a cloth_graph's p, two rows a node", p, 2 * (size_t)g->nn);
    for (j = 0; j < g->nn && !status; j++)
        if (!clothi_finite(clothi_dot3(p + 6 * (size_t)j, p + 6 * (size_t)j)))
            status = clothi_fail(hooks, CLOTH_ERR_NONFINITE, "a cloth_graph's p: r of node %i is "
                                 "too long", j);
    if (status) return status;
    return clothi_check_vector(hooks, "a cloth_graph's weight", g->weight, g->start[g->nn]);
}

CLOTH_API cloth_status cloth_graph_deform(const cloth_hooks *hooks, const cloth_graph *graph,
                                          const double *X, const double *p, double *x) {
    cloth_status status = clothi_graph_check(hooks, graph, p);
    int          i, j, k;
    if (!status) status = clothi_rows_check(hooks, "cloth_graph_deform: X", X, (size_t)graph->nv);
    if (!status && (!x || x == X)) status = clothi_null(hooks, "cloth_graph_deform: x (or X)");
    if (status) return status;
    memset(x, 0, 3 * (size_t)graph->nv * sizeof(double));
    for (j = 0; j < graph->nn; j++) {
        const double           *g = graph->g + 3 * (size_t)j, *to = p + 6 * (size_t)j + 3;
        const clothi_graph_turn t = clothi_graph_rotation(p + 6 * (size_t)j);
        for (i = graph->start[j]; i < graph->start[j + 1]; i++) {
            const size_t v = 3 * (size_t)graph->vertex[i];
            double       a[3], y[3];
            clothi_sub3(X + v, g, a);
            clothi_graph_twist(t.r, t.s, t.c, a, y);
            for (k = 0; k < 3; k++)
                x[v + (size_t)k] += graph->weight[i] * (y[k] + g[k] + to[k]);
        }
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_graph_vjp(const cloth_hooks *hooks, const cloth_graph *graph,
                                       const double *X, const double *p, const double *a,
                                       double *g_p, double *g_X) {
    cloth_status status = clothi_graph_check(hooks, graph, p);
    int          i, j, k;
    if (!status) status = clothi_rows_check(hooks, "cloth_graph_vjp: X", X, (size_t)graph->nv);
    if (!status) status = clothi_rows_check(hooks, "cloth_graph_vjp: a", a, (size_t)graph->nv);
    for (j = 0; !status && j < graph->nn; j++) {
        const clothi_graph_turn t = clothi_graph_rotation(p + 6 * (size_t)j);
        double                  moment[3] = {0, 0, 0}, force[3] = {0, 0, 0};
        for (i = graph->start[j]; i < graph->start[j + 1]; i++) {
            const size_t v = 3 * (size_t)graph->vertex[i];
            double       arm[3], y[3], f[3], m[3];
            for (k = 0; k < 3; k++) f[k] = graph->weight[i] * a[v + (size_t)k];
            clothi_sub3(X + v, graph->g + 3 * (size_t)j, arm);
            clothi_graph_twist(t.r, t.s, t.c, arm, y);
            clothi_cross3(y, f, m);
            for (k = 0; k < 3; k++) moment[k] += m[k], force[k] += f[k];
            clothi_graph_twist(t.r, -t.s, t.c, f, y);       /* R' f */
            for (k = 0; k < 3 && g_X; k++) g_X[v + (size_t)k] += y[k];
        }
        if (g_p) clothi_graph_push(&t, moment, force, g_p + 6 * (size_t)j);
    }
    return status;
}

CLOTH_API cloth_status cloth_graph_rigidity(const cloth_hooks *hooks, const cloth_graph *graph,
                                            const double *p, double beta, double *loss,
                                            double *g_p) {
    cloth_status status = clothi_graph_check(hooks, graph, p);
    double       sum = 0, arm[3], y[3], f[3], m[3];
    int          i, k;
    if (!status) status = clothi_factor_check(hooks, "cloth_graph_rigidity: beta", beta);
    for (i = 0; !status && i < 2 * graph->nedge; i++) {     /* each pair both ways */
        const size_t a = (size_t)graph->edge[i], b = (size_t)graph->edge[i ^ 1];
        const double           *q = p + 6 * a + 3, *r = p + 6 * b + 3;
        const clothi_graph_turn t = clothi_graph_rotation(p + 6 * a);
        clothi_sub3(graph->g + 3 * b, graph->g + 3 * a, arm);
        clothi_graph_twist(t.r, t.s, t.c, arm, y);
        for (k = 0; k < 3; k++) f[k] = y[k] - arm[k] + q[k] - r[k];
        sum += beta * clothi_dot3(f, f);
        for (k = 0; k < 3; k++) f[k] *= 2 * beta;
        clothi_cross3(y, f, m);
        if (!g_p) continue;
        clothi_graph_push(&t, m, f, g_p + 6 * a);
        for (k = 0; k < 3; k++) g_p[6 * b + 3 + (size_t)k] -= f[k];
    }
    if (!status && loss) *loss += sum;
    return status;
}

/* ===== [7.1] CHANGES =========================================================================
 *
 * 0.2.0  first version
 */

#ifdef CLOTHI_OWN_SQRT
#  pragma pop_macro("sqrt")
#endif
#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
