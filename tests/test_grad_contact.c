/* test_grad_contact.c - the derivative of a run in contact: against differences by each cause, with
 * every kind of body; the same bits under a budget; what is called in doubt.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_grad_contact.c -lm */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "test.h"
#include "collide_world.h"
#include "grad_touch.h"
#include "reference.h"
#include "shapes.h"
#include "exact.h"
#include "stage.h"

static touch_graded made[2];

/* Causes [from, to) of scene t, to 1e-4; measured: 1e-6 and better. Of LEAPFROG to that, where
 * differences know it: a time of impact that is a millionth early makes its derivative 6e-6 off. */
static void compare(touch t, int from, int to) {
    touch_graded *g = made;
    int     by;
    touch_grade(g, t, 0);
    CHECK(g->status == CLOTH_OK && g->rep.valid);
    CHECK(t.leapfrog ? g->rep.rows > 0 && g->rep.margin > 0 : g->t.contacts > 0);
    if (!g->rep.valid) printf("  scene %u: %s, step %d\n", t.seed, g->rep.why, g->rep.step);
    for (by = from; by < to; by++) {
        double error, a, b;
        int    failed = 0;
        if (by < TOUCH_ALL && !touch_in(&t, by, by)) continue;
        if (by == TOUCH_CAUSES || (t.leapfrog && (by == TOUCH_FRICTION || by == TOUCH_PART)))
            continue;                       /* its zones have no friction */
        a = touch_along(&g->r, &g->t, by);
        /* of bending more: it is worth 1e-8 of the loss, where 1e-3 is lost in rounding, and 0.3
         * tells 5e-8 apart (0.01 to 0.1: 2e-7 to 4e-5, by chance); of friction, where of scene 5
         * 1e-3 knows 4 digits, 0.03 7 */
        b = touch_difference(&g->t, by, by == TOUCH_BENDING ? 0.3 : by == TOUCH_FRICTION ? 0.03
                                        : 1e-3, &error, &failed);
        if (test_full())
            printf("  %-8s %2u by %-9s %17.10e %17.10e  %.1e\n", touch_body[t.body], t.seed,
                   touch_cause[by], a, b, fabs(a - b) / fmax(fabs(a), fabs(b)));
        CHECK(failed == 0);
        CHECK_REL(a, b, !t.leapfrog ? 1e-4 : by == TOUCH_BENDING ? 1e-5 : 2e-6);
    }
    touch_close(&g->t);
}

static void each_cause(void) {
    compare(touch_make(1), 0, TOUCH_CAUSES);
    if (test_quick()) return;
    compare(touch_make(14), 0, TOUCH_CAUSES);
    if (test_full()) compare(touch_make(5), 0, TOUCH_CAUSES);   /* else in each_body by all */
}

static void each_body(void) {
    static const unsigned seed[] = {0, 2, 3, 4, 5};
    int i;
    for (i = 0; i < (test_quick() ? 3 : 5); i++)
        compare(touch_make(seed[i]), TOUCH_START, TOUCH_REST + 1);
}

/* Every cause at work at once, contact among them: attachments to space, to cloth and to the body,
 * pins and forces by the step, wind, damping, what params hold, parts, a host's term; by all of a
 * kind, of some scenes by each. (Twice was counted what the friction of a part does at the corners
 * of a body, and nothing of a body went by what it carries.) */
static void all_causes(void) {
    static const struct {
        unsigned seed;
        int      bdf2, given, each;
    } row[] = {{2, 0, 1, 0}, {23, 1, 1, 0}, {2, 1, 0, 1}, {3, 0, 1, 1}, {10, 0, 0, 0},
               {12, 1, 0, 0}, {10, 1, 0, 0}};
    int i;                                  /* each cause of row 3, all steps of row 1: long */
    for (i = 0; i < (test_quick() ? 1 : test_full() ? 7 : 4); i++) {
        touch t = touch_make(row[i].seed);
        t.rich = 1;
        t.pins = 1;
        t.bdf2 = row[i].bdf2;
        t.given = row[i].given;
        if (i == 1 && !test_full()) t.steps = 12;
        if (row[i].each && (i == 2 || test_full())) {
            compare(t, TOUCH_X0, TOUCH_CAUSES);
            compare(t, TOUCH_DENSITY, TOUCH_ALL);
        } else {
            compare(t, TOUCH_START, TOUCH_REST + 1);
            compare(t, TOUCH_RICH, TOUCH_RICH + 1);
        }
    }
}

/* The last two substeps of each step reach the ones before through the anchors. */
static void substeps(void) {
    touch t = touch_make(3);
    t.substeps = 3;
    t.steps = 16;
    t.bdf2 = 1;
    compare(t, TOUCH_START, TOUCH_REST + 1);
    if (test_quick()) return;
    t.substeps = 40;
    t.steps = 4;
    t.h = 0.02;
    t.fall = 1;
    compare(t, TOUCH_START, TOUCH_REST + 1);
    CHECK(made[0].t.again > 1);             /* the first one has no history */
}

/* Two steps of BDF2 that have a history turn out to be impacts, and are of implicit Euler. */
static void impacts(void) {
    touch t = touch_make(1);
    t.bdf2 = 1;
    t.fall = 0.5;
    compare(t, TOUCH_START, TOUCH_REST + 1);
}

static void pressed_at(int k, const double *x, const double *v, double *gx, double *gv,
                       void *user) {
    int i;
    (void)x, (void)v, (void)gv, (void)user;
    for (i = 0; k == 8 && i < 75; i++) gx[i] += sin(i);
}

/* A box comes down on a sheet that lies on a plane until they are 2.5 mm apart: a barrier of full
 * size finds no room in one of the 8 steps. Sum of sin(i) x_i by v0[23] = dv; its derivative. */
static double pressed(double dv, double *v0, int *valid) {
    double              ground[3] = {0, 0, 0}, at[3] = {0.1, 0.05, 0.1}, x[24], sum = 0;
    const double        half[3] = {0.07, 0.02, 0.06};
    cloth_desc          d = cloth_desc_default();
    cloth_collide_desc  cd = cloth_collide_desc_default();
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_tape         *tape = NULL;
    world               w;
    cloth_grad          g;
    cloth_grad_report   rep;
    int                 i;
    memset(&w, 0, sizeof w);
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 5, 5, 0.2, 0.2, &w.mesh));
    for (i = 0; i < w.mesh->nv; i++) w.mesh->x[3 * i + 1] = 3.2e-3 + 2e-4 * sin(9 * i);
    cloth_desc_set_mesh(&d, w.mesh);
    d.contact = CLOTH_CONTACT_OBSTACLES, d.linear = CLOTH_LINEAR_CHOLESKY;
    d.material.membrane = 300, d.material.bending = 1e-4, d.tolerance = 1e-12;
    d.cg_tolerance = 1e-4, cd.thickness = 4e-3, cd.stiffness = 2e5, cd.slip = 1e-4;
    CHECK(!world_start(&w, &d, &cd));
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground;
    CHECK(!cloth_collide_add(w.c, &o, &id));
    cloth_obstacle_box(at, half, NULL, x);
    o.kind = CLOTH_OBSTACLE_BOX, o.x = x;
    CHECK(!cloth_collide_add(w.c, &o, &id));
    cloth_sim_state(w.sim)->v[23] = dv;
    CHECK(!v0 || !cloth_tape_create(w.sim, NULL, &tape));
    for (i = 0; i < 8; i++) {
        at[1] = fmax(at[1] - 6e-3, 0.0225);
        cloth_obstacle_box(at, half, NULL, x);
        CHECK(!cloth_collide_move(w.c, id, x) && !cloth_step(w.sim, 0.01, NULL));
    }
    for (i = 0; i < 75; i++) sum += sin(i) * cloth_sim_state(w.sim)->x[i];
    memset(&g, 0, sizeof g);
    g.v0 = v0;
    if (v0) CHECK(!cloth_grad_backward(tape, pressed_at, NULL, &g, &rep));
    if (v0) *valid = rep.valid;
    cloth_tape_destroy(tape), world_close(&w);
    return sum;
}

/* What a substep's barrier was made with is known to the walk: 1.6e-7 for 3.4e-7 it was. */
static void squeezed(void) {
    double v0[75];
    int    valid = 0;
    (void)pressed(0, v0, &valid);
    CHECK(valid);
    CHECK_REL(v0[23], (pressed(1e-6, NULL, NULL) - pressed(-1e-6, NULL, NULL)) / 2e-6, 1e-2);
}

/* Less memory: steps are run anew, and nothing changes. */
static void budget(void) {
    touch       t = touch_make(2);
    cloth_tape *tape = NULL;
    cloth_grad  g;
    touch_loss  u;
    size_t      most;
    touch_grade(made, t, 0);
    touch_grade(made + 1, t, made[0].rep.bytes - made[0].rep.bytes / 20);
    CHECK(made[0].status == CLOTH_OK && made[1].status == CLOTH_OK);
    CHECK(made[1].rep.replayed > 0 && made[0].rep.replayed == 0);
    CHECK(made[1].rep.bytes <= made[0].rep.bytes - made[0].rep.bytes / 20);
    CHECK(memcmp(made[0].r.x0, made[1].r.x0, sizeof made[0].r.x0) == 0);
    CHECK(memcmp(made[0].r.v0, made[1].r.v0, sizeof made[0].r.v0) == 0);
    CHECK(memcmp(made[0].r.friction, made[1].r.friction, sizeof made[0].r.friction) == 0);
    CHECK(memcmp(made[0].r.obstacle, made[1].r.obstacle, sizeof made[0].r.obstacle) == 0);
    touch_close(&made[0].t);
    touch_close(&made[1].t);
    t = touch_make(11);                     /* what contact keeps grows on the way */
    t.bytes = 256701;
    memset(&u, 0, sizeof u);
    memset(&g, 0, sizeof g);
    g.v0 = made[0].r.v0;
    (void)touch_run(&t, &tape);
    u.nv = t.mesh->nv;
    CHECK(cloth_grad_backward(tape, touch_loss_at, &u, &g, NULL) == CLOTH_OK);
    (void)cloth_tape_bytes(tape, &most);
    CHECK(most <= t.bytes && most > t.bytes / 2);
    cloth_tape_destroy(tape);
    touch_close(&t);
}

static void scaled_loss_at(int k, const double *x, const double *v, double *gx, double *gv,
                           void *user) {
    const int *by = (const int *)user;      /* numbers of x; the power of two                  */
    int        i;
    for (i = 0; i < by[0]; i++) {
        gx[i] = ldexp(touch_noise((unsigned)(k * by[0] + i)) + x[i], by[1]);
        gv[i] = ldexp(0.01 * v[i], by[1]);
    }
}

/* A loss 2^k times as large has a gradient of 2^k times the bits, where squares of both are beyond
 * doubles, or 0. (It was 0, or not solved to its tolerance, and called valid.) */
static void losses_of_any_size(void) {
    static const int power[3] = {0, -700, 500};
    touch_results   *r = &made[0].r;
    cloth_grad_report rep;
    double            x0[3 * 200], body[3 * 162];
    int               i, j, k, by[2], off;
    for (i = 0; i < 3; i++) {
        touch       t = touch_make(i == 1 ? 10 : 2);
        cloth_tape *tape = NULL;
        t.rich = i == 1, t.leapfrog = i == 2, t.steps = 8;
        (void)touch_run(&t, &tape);
        CHECK(t.contacts > 0 || t.rows > 0);
        for (j = 0; j < 3; j++) {
            touch_results_open(r, &t);
            by[0] = 3 * t.mesh->nv, by[1] = power[j];
            CHECK(!cloth_grad_backward(tape, scaled_loss_at, by, &r->g, &rep) && rep.valid);
            for (k = 0; k < by[0]; k++) r->x0[k] = ldexp(r->x0[k], -power[j]);
            for (k = 0; k < 3 * t.body_nv; k++) r->obstacle[k] = ldexp(r->obstacle[k], -power[j]);
            if (j == 0) memcpy(x0, r->x0, sizeof x0), memcpy(body, r->obstacle, sizeof body);
            for (k = off = 0; k < by[0]; k++) off += fabs(x0[k] - r->x0[k]) > 0;
            for (k = 0; k < 3 * t.body_nv; k++) off += fabs(body[k] - r->obstacle[k]) > 0;
            CHECK(off == 0);
        }
        cloth_tape_destroy(tape), touch_close(&t);
    }
}

/* Surfaces that turn, as drums or with what turns as a body, in one substep and in three. */
static void turning(void) {
    int i;
    for (i = 0; i < (test_quick() ? 4 : 8); i++) {
        touch t = touch_make((unsigned)(i % 4 < 2 ? 0 : i % 4 == 2 ? 1 : 3));
        if (i == 1) t = touch_make(2);      /* plane, box; sphere, capsule */
        if (i % 4 < 2) t.spin = 3;
        else t.turn = 3;
        if (i > 5) t.spin = 2;
        t.substeps = i / 4 || i == 3 ? 3 : 1;
        t.steps = 16;
        compare(t, TOUCH_START, TOUCH_REST + 1);
    }
}

/* Normals of a grid, which are taken as constant; a search that its cap ends. */
static void doubts(void) {
    touch t = touch_make(0);
    t.grid = 1;
    touch_grade(made, t, 0);
    CHECK(made[0].status == CLOTH_OK && !made[0].rep.valid && made[0].t.contacts > 0);
    CHECK((made[0].rep.doubt & CLOTH_GRAD_FROZEN) && made[0].rep.why[0]);
    touch_close(&made[0].t);
    t = touch_make(1);
    t.cap = 8;
    t.blind = 1;
    touch_grade(made, t, 0);
    CHECK(made[0].status == CLOTH_OK && (made[0].rep.doubt & CLOTH_GRAD_EARLY));
    touch_close(&made[0].t);
}

/* Steps of a loose tolerance, from whose ends Newton's method would go through what is beside the
 * cloth: what is estimated of that stays a number, and so does the derivative by the body. (By the
 * energy there, which is infinite, a friction was none: the body got NaN, under a report that may
 * call the gradient valid.) */
static void stopped_before_a_pole(void) {
    static const unsigned seed[] = {49, 45, 58};            /* sphere, capsule, mesh */
    int i, k, none;
    for (i = 0; i < (test_quick() ? 1 : 3); i++) {
        touch t = touch_make(seed[i]);
        t.tolerance = 1e-2;
        touch_grade(made, t, 0);
        CHECK(made[0].status == CLOTH_OK && (made[0].rep.doubt & CLOTH_GRAD_EARLY));
        CHECK(isfinite(made[0].rep.early));
        for (k = none = 0; k < 3 * made[0].t.body_nv * (t.steps + 1); k++)
            none += !isfinite(made[0].r.obstacle[k]);
        CHECK(none == 0);
        touch_close(&made[0].t);
    }
}

/* LEAPFROG: through the programs of impact zones, with every kind of body, and what made their
 * rows; all other causes besides, a host's term among them. */
static void zones(void) {
    static const unsigned seed[] = {2, 1, 0, 3, 4, 5, 8};
    int                   i, n = test_quick() ? 2 : test_full() ? 7 : 4;
    for (i = 0; i < n; i++) {
        touch t = touch_make(seed[i]);
        t.leapfrog = 1;
        t.steps = 10;
        t.rich = i == 0;
        compare(t, TOUCH_START, TOUCH_REST + 1);
        CHECK(made[0].rep.redundant >= 0 && made[0].rep.factorizations == 0);
        if (i == 0) compare(t, TOUCH_RICH, TOUCH_RICH + 1);
        if (test_full() || (!test_quick() && i % 2 == 0)) compare(t, 0, TOUCH_CAUSES);
    }
}

static void corner_at(int k, const double *x, const double *v, double *gx, double *gv,
                      void *user) {
    int i;
    (void)x, (void)v, (void)gv, (void)user;
    for (i = 0; k == 2 && i < 9; i++) gx[i] += sin(i + 1);
}

/* One face, which falls with a corner on a ball, off the plane across one of its legs by `aside`
 * rad; LEAPFROG. Sum of sin(i + 1) x_i, x[0] moved by dx, v[0] by dv; by[2]: its derivatives. */
static double corner(double aside, double dx, double dv, double *by) {
    static const int    faces[3] = {0, 1, 2};
    const double        rest[9] = {0, 0, 0, 0.05, 0, 0, 0, 0, 0.05};
    const double        ball[3] = {-0.101 * aside, -0.101 * 0.8, -0.101 * 0.6};
    double              x0[9], v0[9], sum = 0;
    cloth_desc          d = cloth_desc_default();
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_tape         *tape = NULL;
    world               w;
    cloth_grad          g;
    cloth_grad_report   rep;
    int                 i;
    memset(&w, 0, sizeof w);
    d.nv = 3, d.x_rest = rest, d.nf = 1, d.faces = faces;
    d.integrator = CLOTH_INTEGRATOR_LEAPFROG, d.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(!world_start(&w, &d, NULL));
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0.1, o.x = ball;
    CHECK(!cloth_collide_add(w.c, &o, &id));
    for (i = 1; i < 9; i += 3) cloth_sim_state(w.sim)->v[i] = -0.3;
    cloth_sim_state(w.sim)->x[0] += dx, cloth_sim_state(w.sim)->v[0] += dv;
    cloth_sim_state_changed(w.sim);
    CHECK(!by || !cloth_tape_create(w.sim, NULL, &tape));
    for (i = 0; i < 2; i++) CHECK(!cloth_step(w.sim, 2e-3, NULL));
    for (i = 0; i < 9; i++) sum += sin(i + 1) * cloth_sim_state(w.sim)->x[i];
    memset(&g, 0, sizeof g);
    g.x0 = x0, g.v0 = v0;
    if (by) {
        CHECK(!cloth_grad_backward(tape, corner_at, NULL, &g, &rep) && rep.valid && rep.rows > 0);
        by[0] = x0[0], by[1] = v0[0];
    }
    cloth_tape_destroy(tape), world_close(&w);
    return sum;
}

/* The normal at a corner is that of the distance, however square it is to a side: within 1e-4 rad
 * it was taken square to that, and what it turns by was not in the run. */
static void corners(void) {
    static const double aside[] = {2e-4, 8e-5, 2e-5};
    double              by[2], dx, dv;
    int                 i;
    for (i = 0; i < 3; i++) {
        (void)corner(aside[i], 0, 0, by);
        dx = corner(aside[i], 1e-7, 0, NULL) - corner(aside[i], -1e-7, 0, NULL);
        dv = corner(aside[i], 0, 1e-5, NULL) - corner(aside[i], 0, -1e-5, NULL);
        CHECK_REL(by[0], dx / 2e-7, 1e-6);  /* 1e-9; 6e-4 it was */
        CHECK_REL(by[1], dv / 2e-5, 1e-6);
    }
}

static void plain_loss(int k, const double *x, const double *v, double *g_x, double *g_v,
                       void *user) {
    int i;
    (void)k, (void)v, (void)g_v;
    for (i = 0; i < 3 * *(const int *)user; i++) g_x[i] += x[i] * (1 + i % 5);
}

/* A sheet that is pressed together by its pins, on a plane, with a stitch, whose entries are not of
 * the mesh: where a step ends on a saddle the gradient comes back in doubt, not as an error. */
static void saddle(unsigned long long seed) {
    enum { N = 7 };
    static const double bary[3] = {0.3, 0.3, 0.4}, ground[3] = {0, -0.006, 0};
    cloth_mesh         *mesh;
    cloth_pin           pins[2 * N];
    cloth_attachment    stitch;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_tape         *tape = NULL;
    cloth_grad          g;
    cloth_grad_report   rep;
    stage               s;
    int                 i, k;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, 0.2, 0.2, &mesh)) exit(2);
    for (i = 0; i < mesh->nv; i++) mesh->x[3 * i + 1] += ref_uniform(&seed, -2e-3, 2e-3);
    stage_cloth(&s, mesh);
    for (i = 0; i < N; i++) pins[i].vertex = i, pins[N + i].vertex = N * (N - 1) + i;
    for (i = 0; i < 2 * N; i++) pins[i].axes = CLOTH_AXIS_ALL;
    s.desc.npins = 2 * N, s.desc.pins = pins;
    s.desc.material.membrane = 300;
    s.desc.contact = CLOTH_CONTACT_OBSTACLES;
    if (!stage_start(&s)) exit(2);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground;
    CHECK(cloth_collide_add(s.c, &o, &id) == CLOTH_OK);
    CHECK(cloth_sim_stitch(s.sim, 20, bary, 3, 50, bary, &stitch) == CLOTH_OK);
    CHECK(cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
    for (k = 1; k <= 8; k++) {
        for (i = N * (N - 1); i < N * N; i++) {
            const double to[3] = {s.mesh->x[3 * i], 0, s.mesh->x[3 * i + 2] - 0.004 * k};
            CHECK(cloth_sim_pin(s.sim, i, CLOTH_AXIS_ALL, to) == CLOTH_OK);
        }
        CHECK(cloth_step(s.sim, 1.0 / 30, NULL) == CLOTH_OK);
    }
    memset(&g, 0, sizeof g);
    CHECK(cloth_grad_backward(tape, plain_loss, &s.mesh->nv, &g, &rep) == CLOTH_OK);
    CHECK(rep.valid || rep.doubt);
    cloth_tape_destroy(tape);
    stage_end(&s);
}

static void saddles(void) {
    unsigned long long seed;
    for (seed = 1; seed <= 40; seed++) saddle(seed);
}

/* A teleport ends a tape with a sentence; what was recorded before stays good. */
static void teleport(void) {
    touch        t = touch_make(1);
    cloth_tape  *tape = NULL;
    touch_loss   u;
    touch_results *r = &made[0].r;
    const double up[3] = {0.02, -0.3, 0};
    t.steps = 9;
    memset(&u, 0, sizeof u);
    (void)touch_run(&t, &tape);
    u.nv = t.mesh->nv;
    touch_results_open(r, &t);
    CHECK(!cloth_tape_ended(tape));
    CHECK(cloth_collide_teleport(t.c, t.id, up) == CLOTH_OK);
    CHECK(cloth_tape_ended(tape) && strstr(cloth_tape_ended(tape), "teleported"));
    CHECK(cloth_step(t.sim, t.h, NULL) == CLOTH_OK && cloth_tape_steps(tape) == 9);
    CHECK(cloth_grad_backward(tape, touch_loss_at, &u, &r->g, NULL) == CLOTH_OK);
    cloth_collide_destroy(t.c);             /* nothing is taken for no contact */
    t.c = NULL;
    memset(&r->g, 0, sizeof r->g);
    CHECK(cloth_grad_backward(tape, touch_loss_at, &u, &r->g, NULL) == CLOTH_ERR_FORMAT);
    cloth_tape_destroy(tape);
    touch_close(&t);
}

/* An obstacle that is refused takes no slot, ends no tape and changes no snapshot: a gradient's
 * friction has as many numbers as before. */
static void refused_obstacle(void) {
    touch               t = touch_make(1);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_tape         *tape = NULL;
    cloth_grad          g;
    touch_loss          u;
    double              friction[3] = {0, 0, 7};    /* of one obstacle, and behind them        */
    uint64_t            hash;
    t.steps = 9;
    memset(&u, 0, sizeof u);
    memset(&g, 0, sizeof g);
    (void)touch_run(&t, &tape);
    u.nv = t.mesh->nv;
    hash = cloth_sim_hash(t.sim);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0.02, o.x = cloth_sim_state(t.sim)->x;
    CHECK(cloth_collide_add(t.c, &o, NULL) == CLOTH_ERR_MESH);
    CHECK(!cloth_tape_ended(tape) && cloth_sim_hash(t.sim) == hash);
    g.friction = friction;
    CHECK(cloth_grad_backward(tape, touch_loss_at, &u, &g, NULL) == CLOTH_OK);
    CHECK(fabs(friction[1]) > 0 && friction[2] >= 7 && friction[2] <= 7);
    cloth_tape_destroy(tape);
    touch_close(&t);
}

/* The n-th allocation of a walk backwards fails: zeros, nothing is lost, and the next call works.
 * */
static void memory(void) {
    static host       told;
    const cloth_hooks hooks = host_hooks(&told);
    touch_loss        u;
    int               n, failed = 1;
    memset(&u, 0, sizeof u);
    for (n = 1; failed && n < 60; n++) {
        touch_graded *g = made;
        cloth_tape *tape = NULL;
        uint64_t    hash;
        g->t = touch_make(1);
        g->t.tolerance = 1e-8;
        g->t.steps = 10;
        g->t.hooks = &hooks;
        (void)touch_run(&g->t, &tape);
        u.nv = g->t.mesh->nv;
        u.seed = g->t.seed;
        touch_results_open(&g->r, &g->t);
        hash = cloth_sim_hash(g->t.sim);
        g->r.x0[0] = g->r.friction[1] = 7;
        told.fail_at = told.calls + n;
        g->status = cloth_grad_backward(tape, touch_loss_at, &u, &g->r.g, NULL);
        failed = told.calls >= told.fail_at;
        told.fail_at = 0;
        CHECK(g->status == (failed ? CLOTH_ERR_MEMORY : CLOTH_OK));
        CHECK(!failed || !(fabs(g->r.x0[0]) > 0 || fabs(g->r.friction[1]) > 0));
        CHECK(cloth_sim_hash(g->t.sim) == hash);
        CHECK(cloth_grad_backward(tape, touch_loss_at, &u, &g->r.g, NULL) == CLOTH_OK);
        CHECK(fabs(g->r.x0[0]) > 0);
        cloth_tape_destroy(tape);
        touch_close(&g->t);
        CHECK(told.live == 0);
    }
    CHECK(n > 5 && !failed);
}

/* A body that slides past pins takes none along: no gradient knew of that, and said valid. */
static void pins_stay(void) {
    static const unsigned seed[2] = {16, 58};
    static const int      steps[2] = {8, 6};
    int                   i, k;
    for (i = 0; i < 2; i++) {
        touch         t = touch_make(seed[i]);
        const double *x;
        t.steps = steps[i];
        (void)touch_run(&t, NULL);
        CHECK(t.failed == 0 && t.pins && t.contacts > 0);
        x = cloth_sim_state(t.sim)->x;
        for (k = 0; k < 3; k++) {
            CHECK_NEAR(x[k], t.mesh->x[k], 1e-15);
            CHECK_NEAR(x[3 * (t.n - 1) + k], t.mesh->x[3 * (t.n - 1) + k], 1e-15);
        }
        touch_close(&t);
        compare(touch_make(seed[i]), TOUCH_START, TOUCH_REST + 1);
    }
}

/* --- steps that are shortened --- */

enum { PART_X0, PART_PIN, PART_ATTACH, PART_BOX, PART_CAUSES, PART_NV = 25, PART_STEPS = 3,
       PART_SLOTS = 2 };

typedef struct part_way {                   /* `by`: what is moved, by eps times its direction */
    cloth_mesh     *mesh;
    cloth_model    *model;
    cloth_sim      *sim;
    cloth_collide  *c;
    cloth_obstacle  box;
    double          box_x[24];              /* m, at the start                                 */
    int             by, shortened;          /* steps                                           */
    double          eps, sum;               /* of the loss                                     */
    double          along;                  /* derivative by the box along its direction       */
} part_way;

static double part_dir(int by, int i) {
    return 1e-3 * touch_noise(7001u * (unsigned)by + (unsigned)i);
}

static double part_moved(const part_way *p, int by, int i) {
    return p->by == by ? p->eps * part_dir(by, i) : 0;
}

static void part_loss(int k, const double *x, const double *v, double *gx, double *gv,
                      void *user) {
    part_way *p = (part_way *)user;
    int       i;
    for (i = 0; i < 3 * PART_NV; i++) {
        const double a = touch_noise(31u + (unsigned)(3 * PART_NV * k + i));
        p->sum += a * (x[i] + 0.01 * v[i]);
        if (gx) gx[i] += a, gv[i] += 0.01 * a;
    }
}

static void part_box(int k, cloth_obstacle id, const double *g_x_end, void *user) {
    part_way *p = (part_way *)user;
    int       i;
    CHECK(id.id == p->box.id);
    for (i = 0; i < 24; i++) p->along += g_x_end[i] * part_dir(PART_BOX, 24 * k + i);
}

/* The middle of a sheet is sent into a box that comes up and carries a point of the sheet; another
 * point is drawn down from the second step on. */
static cloth_status part_run(cloth_sim *sim, void *user) {
    static const double at[3] = {0.25, 0.35, 0.4};
    part_way        *p = (part_way *)user;
    cloth_attachment hook;
    cloth_report     r;
    cloth_status     status = CLOTH_OK;
    double           x[24], to[3];
    int              k, i;
    hook.id = 0;
    for (k = 0; k < PART_STEPS && !status; k++) {
        for (i = 0; i < 3; i++)
            to[i] = p->mesh->x[36 + i] - 0.03 * (i == 1) +
                    part_moved(p, PART_PIN, 3 * PART_NV * k + 36 + i);
        CHECK(!cloth_sim_pin(sim, 12, CLOTH_AXIS_ALL, to));
        for (i = 0; i < 3; i++)
            to[i] = 0.05 * i - 0.03 * k + part_moved(p, PART_ATTACH, 3 * PART_SLOTS * k + 3 + i);
        if (k == 1) CHECK(!cloth_sim_attach(sim, 20, at, 4, to, &hook));
        if (k > 1) CHECK(!cloth_sim_attach_move(sim, hook, to));
        for (i = 0; i < 24; i++)
            x[i] = p->box_x[i] + 1e-3 * (k + 1) * (i % 3 == 1) - part_moved(p, PART_BOX, i) +
                   part_moved(p, PART_BOX, 24 * (k + 1) + i);
        CHECK(!cloth_collide_move(p->c, p->box, x));
        status = cloth_collide_step(p->c, 0.01, 6, &r);
        p->shortened += cloth_collide_last(p->c).fraction < 1;
        part_loss(k + 1, cloth_sim_state(sim)->x, cloth_sim_state(sim)->v, NULL, NULL, p);
    }
    return status;
}

static void part_open(part_way *p, cloth_integrator by, int substeps) {
    static const double middle[3] = {0.1, -0.07, 0.1}, half[3] = {0.08, 0.05, 0.08};
    static const double at[3] = {0.25, 0.35, 0.4};
    const cloth_pin     pin = {12, CLOTH_AXIS_ALL};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_desc          d = cloth_desc_default();
    cloth_attachment    id;
    int                 i;
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 5, 5, 0.2, 0.2, &p->mesh));
    cloth_desc_set_mesh(&d, p->mesh);
    d.npins = 1, d.pins = &pin, d.max_attachments = PART_SLOTS;
    d.integrator = by, d.substeps = substeps, d.tolerance = 1e-12;
    d.contact = CLOTH_CONTACT_OBSTACLES;
    d.material.membrane = 100;
    CHECK(!cloth_model_create(&d, &p->model) && !cloth_sim_create(p->model, &p->sim));
    CHECK(!cloth_collide_create(p->sim, NULL, &p->c));
    o.kind = CLOTH_OBSTACLE_BOX, o.x = p->box_x;
    cloth_obstacle_box(middle, half, NULL, p->box_x);
    CHECK(!cloth_collide_add(p->c, &o, &p->box));
    for (i = 0; i < 24; i++) p->box_x[i] += part_moved(p, PART_BOX, i);
    CHECK(!cloth_collide_teleport(p->c, p->box, p->box_x));
    CHECK(!cloth_collide_attach(p->c, p->box, 6, at, 2, at, 5, &id));
    for (i = 0; i < 3 * PART_NV; i++) cloth_sim_state(p->sim)->x[i] += part_moved(p, PART_X0, i);
    cloth_sim_state_changed(p->sim);
    p->sum = 0, p->shortened = 0;
}

static void part_close(part_way *p) {
    cloth_collide_destroy(p->c);
    cloth_sim_destroy(p->sim);
    cloth_model_destroy(p->model);
    cloth_mesh_destroy(NULL, p->mesh);
}

static double part_value(cloth_integrator integrator, int substeps, int by, double eps) {
    part_way p;
    memset(&p, 0, sizeof p);
    p.by = by, p.eps = eps;
    part_open(&p, integrator, substeps);
    part_loss(0, cloth_sim_state(p.sim)->x, cloth_sim_state(p.sim)->v, NULL, NULL, &p);
    CHECK(!part_run(p.sim, &p) && p.shortened == PART_STEPS);
    part_close(&p);
    return p.sum;
}

/* Parts of steps: targets of pins, aims of attachments and vertices of bodies are worth the part
 * that was taken, where they were before the rest. (The targets got it all, and it was valid.) */
static void parts_of_steps(void) {
    static const cloth_integrator by[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                           CLOTH_INTEGRATOR_LEAPFROG};
    static double     x0[3 * PART_NV], pin[PART_STEPS * 3 * PART_NV];
    static double     attach[PART_STEPS * 3 * PART_SLOTS];
    cloth_check_row   row[CLOTH_CHECK_ROWS];
    cloth_grad        g;
    cloth_grad_report rep;
    cloth_tape       *tape;
    part_way          p;
    int               i, j, rows;
    for (i = 0; i < 3; i++) {
        const int m = i == 1 ? 2 : 0;
        double    found[PART_CAUSES] = {0, 0, 0, 0};
        memset(&p, 0, sizeof p);
        memset(&g, 0, sizeof g);
        p.by = -1;
        part_open(&p, by[i], m);
        g.x0 = x0, g.pin = pin, g.attach = attach, g.obstacle = part_box, g.user = &p;
        CHECK(!cloth_tape_create(p.sim, NULL, &tape) && !part_run(p.sim, &p));
        CHECK(p.shortened == PART_STEPS);
        CHECK(!cloth_grad_backward(tape, part_loss, &p, &g, &rep) && rep.valid);
        cloth_tape_destroy(tape);
        part_close(&p);
        for (j = 0; j < 3 * PART_NV; j++) found[PART_X0] += x0[j] * part_dir(PART_X0, j);
        for (j = 36; j < PART_STEPS * 3 * PART_NV; j += j % 75 == 38 ? 73 : 1)
            found[PART_PIN] += pin[j] * part_dir(PART_PIN, j);
        for (j = 9; j < PART_STEPS * 6; j += j % 6 == 5 ? 4 : 1)
            found[PART_ATTACH] += attach[j] * part_dir(PART_ATTACH, j);
        found[PART_BOX] = p.along;
        for (j = 0; j < PART_CAUSES; j++) {
            double d[2];
            for (rows = 0; rows < 2; rows++)
                d[rows] = (part_value(by[i], m, j, rows ? 5e-3 : 1e-2) -
                           part_value(by[i], m, j, rows ? -5e-3 : -1e-2)) / (rows ? 1e-2 : 2e-2);
            CHECK_REL(found[j], (4 * d[1] - d[0]) / 3, 1e-4);
        }
        memset(&p, 0, sizeof p);            /* the tangent goes the same way */
        p.by = -1;
        part_open(&p, by[i], m);
        CHECK(!cloth_grad_check(p.sim, part_run, &p, part_loss, &p, row, &rows, NULL));
        CHECK(rows > 0 && strcmp(row[0].cause, "dot product") == 0 && row[0].off < 1e-10);
        part_close(&p);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(each_cause);
    RUN(each_body);
    RUN(all_causes);
    RUN(pins_stay);
    RUN(substeps);
    RUN(turning);
    RUN(impacts);
    RUN(squeezed);
    RUN(budget);
    RUN(losses_of_any_size);
    RUN(doubts);
    RUN(stopped_before_a_pole);
    RUN(zones);
    RUN(corners);
    RUN(saddles);
    RUN(parts_of_steps);
    RUN(teleport);
    RUN(refused_obstacle);
    RUN(memory);
    return TEST_END();
}
