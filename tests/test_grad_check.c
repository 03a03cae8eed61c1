/* test_grad_check.c - the public check of a gradient, on scenes without and with contact; what it
 * refuses.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_grad_check.c -lm */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "test.h"
#include "scene.h"
#include "collide_world.h"
#include "grad_scene.h"
#include "grad_touch.h"
#include "grad_host.h"

typedef struct script {
    const play *p;
    scene      *s;
} script;

static cloth_status run(cloth_sim *sim, void *user) {
    const script    *u = (const script *)user;
    cloth_attachment extra;
    cloth_status     status = CLOTH_OK;
    int              k;
    extra.id = 0;
    for (k = 0; k < u->p->steps && !status; k++) {
        if (!u->p->still) play_say(u->p, u->s, &extra, k);
        play_change(u->p, u->s, k);
        status = cloth_step(sim, u->p->h, NULL);
    }
    return status;
}

static double worst_dot;                    /* adjoint against tangent, all scenes             */

static int table(const char *what, const cloth_check_row *row, int rows, double dot, double most) {
    int i, dots = 0;
    for (i = 0; i < rows; i++) {
        const int d = strcmp(row[i].cause, "dot product") == 0;
        if (test_full() || !(row[i].off <= (d ? dot : most)))
            printf("  %-10s %-12s %17.10e %17.10e  off %.0e, known to %.0e\n", what, row[i].cause,
                   row[i].adjoint, row[i].other, row[i].off, row[i].doubt);
        CHECK(row[i].off <= (d ? dot : most));
        dots += d;
        if (d) worst_dot = fmax(worst_dot, row[i].off);
    }
    return dots;
}

/* What was moved, in order. */
static void causes(const cloth_check_row *row, int rows, const char *want) {
    char text[32 * CLOTH_CHECK_ROWS] = "";
    int  i;
    for (i = 0; i < rows; i++) strcat(strcat(text, i ? ", " : ""), row[i].cause);
    if (!CHECK(strcmp(text, want) == 0)) printf("  moved: %s\n", text);
}

static void hanging(play p, const char *what, const char *moved) {
    cloth_check_row   row[CLOTH_CHECK_ROWS];
    cloth_grad_report rep;
    scene             s;
    script            u;
    loss_user         loss;
    uint64_t          before;
    int               rows;
    p.steps = 8;                            /* before the material changes */
    play_open(&p, &s);
    memset(&loss, 0, sizeof loss);
    loss.nv = s.nv, loss.only = -1;
    u.p = &p, u.s = &s;
    before = cloth_sim_hash(s.sim);
    CHECK(cloth_grad_check(s.sim, run, &u, loss_at, &loss, row, &rows, &rep) == CLOTH_OK);
    CHECK(rep.valid && cloth_sim_hash(s.sim) == before);
    causes(row, rows, moved);
    CHECK(table(what, row, rows, 1e-10, 1e-6) == 1);
    scene_close(&s);
}

static void integrators(void) {
    /* gravity and wind are the script's to say, but where it says nothing */
    static const char moved[] = "dot product, x0, v0, membrane, poisson, bending, damping, "
                                "density, X, theta0, hinge_scale";
    play p = play_default();
    hanging(p, "euler", moved);
    p.ties = 1;
    hanging(p, "ties", moved);
    p = play_default();
    p.integrator = CLOTH_INTEGRATOR_BDF2, p.substeps = 2;
    hanging(p, "bdf2", moved);
    p.integrator = CLOTH_INTEGRATOR_LEAPFROG, p.substeps = 40;
    if (!test_quick()) hanging(p, "leapfrog", moved);
    p = play_default();
    p.still = p.given = 1, p.membrane = CLOTH_MEMBRANE_SPRINGS;
    hanging(p, "given", "dot product, x0, v0, gravity, wind, membrane, bending, damping, mass, X, "
                        "theta0, hinge_scale");
    printf("  adjoint against tangent: off by at most %.1e\n", worst_dot);
}

/* Four steps of so many seconds. */
static cloth_status four(cloth_sim *sim, void *h) {
    cloth_status status = CLOTH_OK;
    int          k;
    for (k = 0; k < 4 && !status; k++) status = cloth_step(sim, *(const double *)h, NULL);
    return status;
}

typedef struct second {                     /* a material that the run itself sets             */
    int            on;
    cloth_material m;
} second;

static cloth_status set_and_four(cloth_sim *sim, void *user) {
    const second *u = (const second *)user;
    double        h = 0.01;
    cloth_status  status = u->on ? cloth_sim_set_material(sim, 1, &u->m) : CLOTH_OK;
    return status ? status : four(sim, &h);
}

/* Two regions far apart, or at a bound: each number is moved by a part of itself and stays legal;
 * what is derived, or set by the run, is no row's. */
static void regions(void) {
    static const char all[] = "dot product, x0, v0, gravity, membrane, poisson, bending, damping, "
                              "density, X, theta0, hinge_scale";
    static const char none[] = "dot product, x0, v0, gravity, X, theta0, hinge_scale";
    static const char given[] = "dot product, x0, v0, gravity, membrane, poisson, bending, "
                                "damping, mass, X, theta0, hinge_scale";
    int k, i;
    for (k = 0; k < 6; k++) {
        cloth_check_row   row[CLOTH_CHECK_ROWS];
        cloth_grad_report rep;
        cloth_material    m[2];
        double            mass[100];
        int               region[100], rows;
        loss_user         loss;
        second            user;
        scene             s;
        scene_desc(&s, 4, NULL, WITH_NOISE);
        s.desc.material.damping = 1e-3, s.desc.tolerance = 1e-12, s.desc.cg_tolerance = 1e-4;
        m[0] = m[1] = s.desc.material;
        if (k == 1) m[1].membrane = 0, m[1].young = 1e6, m[1].thickness = 1e-3;
        if (k == 2) m[1].bending = -1;
        if (k == 3) m[0].poisson = 0.5, m[1].damping = 0;
        if (k == 4) m[0].density = 30, m[1].density = 0.1;
        for (i = 0; i < s.mesh->nf; i++) region[i] = 2 * i >= s.mesh->nf;
        for (i = 0; i < s.nv; i++) mass[i] = i ? 2e-3 : 1;
        if (k == 5) s.desc.vertex_mass = mass;
        s.desc.region = region, s.desc.nregions = 2, s.desc.materials = m;
        CHECK(scene_open(&s, WITH_PINS) == CLOTH_OK);
        memset(&loss, 0, sizeof loss);
        loss.nv = s.nv, loss.only = -1;
        user.on = k == 0, user.m = m[1];
        CHECK(cloth_grad_check(s.sim, set_and_four, &user, loss_at, &loss, row, &rows, &rep) ==
              CLOTH_OK);
        causes(row, rows, k == 0 ? none : k == 5 ? given : all);
        CHECK(rep.valid && table("regions", row, rows, 1e-10, 1e-5) == 1);
        scene_close(&s);
    }
}

/* Two faces stitched: blocks that are in no element, which the factor has not. */
static void stitched(void) {
    static const double a[3] = {0.2, 0.3, 0.5}, b[3] = {0.5, 0.2, 0.3};
    static const cloth_integrator by[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                           CLOTH_INTEGRATOR_LEAPFROG};
    double h = 0.01;
    int    k;
    for (k = 0; k < 3; k += test_quick() ? 2 : 1) {
        cloth_check_row   row[CLOTH_CHECK_ROWS];
        cloth_grad_report rep;
        cloth_attachment  id;
        loss_user         loss;
        scene             s;
        int               rows;
        scene_desc(&s, 5, NULL, WITH_NOISE | WITH_DAMPING | WITH_WIND);
        s.desc.integrator = by[k], s.desc.substeps = k == 2 ? 100 : 0;
        s.desc.tolerance = 1e-12, s.desc.cg_tolerance = 1e-4, s.desc.max_attachments = 1;
        CHECK(scene_open(&s, WITH_PINS) == CLOTH_OK);
        CHECK(cloth_sim_stitch(s.sim, 3, a, 50.0, s.mesh->nf - 4, b, &id) == CLOTH_OK);
        memset(&loss, 0, sizeof loss);
        loss.nv = s.nv, loss.only = -1;
        CHECK(cloth_grad_check(s.sim, four, &h, loss_at, &loss, row, &rows, &rep) == CLOTH_OK);
        CHECK(rep.valid && rows == 13 && (rep.iterations > 0) == (k < 2));
        CHECK(table("stitched", row, rows, 1e-10, 1e-6) == 1);
        scene_close(&s);
    }
}

typedef struct touch_runs {
    touch *t;
    int    left;                            /* runs; then it is cancelled                      */
} touch_runs;

static cloth_status touch_script(cloth_sim *sim, void *user) {
    touch_runs  *u = (touch_runs *)user;
    const touch *t = u->t;
    cloth_status status = u->left-- > 0 ? CLOTH_OK : CLOTH_ERR_CANCELLED;
    double       x[3 * 162];
    int          k;
    for (k = 0; k < t->steps && !status; k++) {
        touch_pose(t, k, x);
        touch_say(t, k);
        if (t->body != TOUCH_SELF) status = cloth_collide_move(t->c, t->id, x);
        if (!status) status = cloth_step(sim, t->h, NULL);
    }
    return status;
}

/* whole: rows by differences too; else the run ends the check before. 2: runs were before it, and
 * what sticks since is dropped by all of it (by x0's differences alone: that row was 0.3 off). */
static void touching(touch t, int whole) {
    cloth_check_row   row[CLOTH_CHECK_ROWS];
    cloth_grad_report rep;
    touch_runs        u;
    touch_loss        loss;
    int               rows, i;
    touch_open(&t);
    memset(&loss, 0, sizeof loss);
    loss.nv = t.mesh->nv, loss.seed = t.seed;
    u.t = &t, u.left = whole ? 1000 : 1;
    for (i = 0; whole > 1 && i < 2; i++) CHECK(touch_script(t.sim, &u) == CLOTH_OK);
    CHECK(cloth_grad_check(t.sim, touch_script, &u, touch_loss_at, &loss, row, &rows, &rep) ==
          (whole ? CLOTH_OK : CLOTH_ERR_CANCELLED));
    CHECK(rep.status == CLOTH_OK && (whole ? rep.valid : rows == 1));
    if (whole)
        causes(row, rows, "dot product, x0, v0, gravity, membrane, poisson, bending, density, X, "
                          "theta0, hinge_scale");
    CHECK(table(touch_body[t.body], row, rows, 1e-10, 1e-4) == 1);
    if (t.leapfrog) CHECK(rep.rows > 0);
    touch_close(&t);
}

/* The tangent of contact, and of what its anchors carry from substep to substep; of the programs of
 * LEAPFROG's zones. */
static void contact(void) {
    static const struct {
        unsigned seed;
        int      bdf2, substeps, rich, leapfrog;
    } row[] = {{1, 0, 1, 0, 0}, {1, 0, 1, 0, 1}, {2, 1, 2, 1, 0}, {2, 0, 1, 1, 1}, {0, 0, 1, 0, 0},
               {3, 1, 3, 0, 0}, {4, 0, 1, 1, 0}, {5, 0, 1, 0, 0}, {5, 0, 1, 0, 1}, {4, 0, 1, 0, 1},
               {3, 0, 1, 0, 1}, {8, 0, 1, 0, 1}};
    const int n = test_quick() ? 5 : (int)(sizeof row / sizeof *row);
    touch     stuck = touch_make(5);
    int       i;
    for (i = 0; i < n; i++) {
        touch t = touch_make(row[i].seed);
        t.bdf2 = row[i].bdf2, t.substeps = row[i].substeps, t.leapfrog = row[i].leapfrog;
        t.rich = row[i].rich;
        if (i) t.steps = 10;
        touching(t, i == 0);
    }
    stuck.steps = 5;
    touching(stuck, 2);
    printf("  in contact, adjoint against tangent: off by at most %.1e\n", worst_dot);
}

/* Layers fall on a ground, each, by LEAPFROG, on what the pass before has stopped: rows of a pass
 * are made where the one before led, and move with that. */
static void passes(double speed, int layers) {
    const double        ground[3] = {0, 0, 0};
    double              h = 0.002;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_desc          d = cloth_desc_default();
    cloth_mesh         *layer[3], *m = NULL;
    cloth_model        *model;
    cloth_sim          *sim;
    cloth_collide      *c;
    cloth_check_row     row[CLOTH_CHECK_ROWS];
    cloth_grad_report   rep;
    touch_loss          loss;
    host                told;
    char                what[24];
    int                 i, k, rows, most = 0;
    for (k = 0; k < layers; k++) {
        CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 4 - k, 4 - k, 0.2 - 0.06 * k,
                                0.2 - 0.06 * k, layer + k));
        for (i = 0; i < layer[k]->nv; i++) {
            double *x = layer[k]->x + 3 * i;
            x[0] += 0.031 * k, x[2] -= 0.027 * k;
            x[1] += 0.0025 + 0.002 * k + 3e-4 * noise((unsigned)(40 * k + i));
        }
    }
    CHECK(!cloth_mesh_merge(NULL, layer, layers, &m));
    cloth_desc_set_mesh(&d, m);
    d.contact = CLOTH_CONTACT_SELF, d.integrator = CLOTH_INTEGRATOR_LEAPFROG, d.substeps = 1;
    d.material.membrane = 20, d.bend = CLOTH_BEND_NONE, d.hooks = host_hooks(&told);
    CHECK(!cloth_model_create(&d, &model));
    CHECK(!cloth_sim_create(model, &sim));
    CHECK(!cloth_collide_create(sim, NULL, &c));
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground;
    CHECK(!cloth_collide_add(c, &o, NULL));
    for (i = 0; i < m->nv; i++) cloth_sim_state(sim)->v[3 * i + 1] = -speed;
    cloth_sim_state_changed(sim);
    memset(&loss, 0, sizeof loss);
    loss.nv = m->nv;
    CHECK(cloth_grad_check(sim, four, &h, touch_loss_at, &loss, row, &rows, &rep) == CLOTH_OK);
    snprintf(what, sizeof what, "%d layers", layers);
    CHECK(rep.valid && table(what, row, rows, 1e-10, 1e-4) == 1);
    for (k = 0; k < 4; k++) {
        CHECK(cloth_step(sim, h, NULL) == CLOTH_OK);
        i = cloth_collide_last(c).passes;
        most = i > most ? i : most;
    }
    CHECK(most >= layers);
    printf("  %s at %g m/s: %d passes, %d rows\n", what, speed, most, rep.rows);
    cloth_collide_destroy(c), cloth_sim_destroy(sim), cloth_model_destroy(model);
    CHECK(told.live == 0);
    for (k = 0; k < layers; k++) cloth_mesh_destroy(NULL, layer[k]);
    cloth_mesh_destroy(NULL, m);
}

static void later_passes(void) {
    passes(2, 2);
    passes(3, 2);
    passes(2, 3);
}

/* A sheet at rest where contact begins: to one side it is pushed, to the other not. Differences
 * meet both however small they are, and say so. (0.8 off they were known to 1.5e-4.) */
static void kinks(void) {
    const double        ground[3] = {0, 0, 0};
    double              h = 0.01;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_desc          d = cloth_desc_default();
    cloth_check_row     row[CLOTH_CHECK_ROWS];
    cloth_grad_report   rep;
    touch_loss          loss;
    world               w;
    int                 i, rows, apart = 0;
    memset(&w, 0, sizeof w);
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 4, 4, 0.2, 0.2, &w.mesh));
    for (i = 0; i < w.mesh->nv; i++) w.mesh->x[3 * i + 1] = 2e-3 + 1e-9;
    cloth_desc_set_mesh(&d, w.mesh);
    d.contact = CLOTH_CONTACT_OBSTACLES, d.tolerance = 1e-12, d.cg_tolerance = 1e-4;
    memset(d.gravity, 0, sizeof d.gravity);
    CHECK(!world_start(&w, &d, NULL));
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground, o.friction = 0;
    CHECK(!cloth_collide_add(w.c, &o, NULL));
    memset(&loss, 0, sizeof loss);
    loss.nv = w.mesh->nv;
    CHECK(!cloth_grad_check(w.sim, four, &h, touch_loss_at, &loss, row, &rows, &rep));
    for (i = 1; i < rows; i++) {
        CHECK(0.2 * row[i].off <= row[i].doubt);
        apart += row[i].off > 1e-3;
    }
    CHECK(apart > 0);
    world_close(&w);
}

/* A run that is another one each time is refused, and the sim is where it was. */
static cloth_status unsteady(cloth_sim *sim, void *user) {
    int *n = (int *)user, k;
    for (k = 0; k < 2 + *n % 2; k++)
        if (cloth_step(sim, 0.01, NULL)) return CLOTH_ERR_STEP;
    ++*n;
    return CLOTH_OK;
}

/* An allocation that fails, each in turn: said, nothing lost, the sim where it was. */
static void out_of_memory(void) {
    static host     told;
    cloth_hooks     hooks = host_hooks(&told);
    cloth_status    status = CLOTH_ERR_MEMORY;
    cloth_check_row row[CLOTH_CHECK_ROWS];
    loss_user       loss;
    scene           s;
    uint64_t        before;
    double          h = 0.01;
    int             rows, n;
    scene_desc(&s, 4, &hooks, 0);
    CHECK(scene_open(&s, WITH_PINS) == CLOTH_OK && cloth_step(s.sim, 0.01, NULL) == CLOTH_OK);
    CHECK(cloth_sim_params(s.sim) != NULL);
    memset(&loss, 0, sizeof loss);
    loss.nv = s.nv, loss.only = -1;
    before = cloth_sim_hash(s.sim);
    for (n = 1; status && n < 300; n++) {
        told.fail_at = told.calls + n;
        status = cloth_grad_check(s.sim, four, &h, loss_at, &loss, row, &rows, NULL);
        told.fail_at = 0;
        CHECK(status == CLOTH_OK || status == CLOTH_ERR_MEMORY);
        CHECK(cloth_sim_hash(s.sim) == before);
    }
    CHECK(status == CLOTH_OK && n > 10);
    scene_close(&s);
    CHECK(told.live == 0);
}

/* A term whose vjp speaks of an x_n that its energy does not know. */
static cloth_status lying_vjp(void *user, const cloth_eval *e, const double *a, cloth_vjp *out) {
    int i;
    for (i = 0; i < 3 * e->nv && out->x_n; i++) out->x_n[i] += 0.1 * a[i];
    return swarm_vjp(user, e, a, out);
}

/* A wrong gradient is seen: by the row's own numbers, against the larger one. */
static void wrong_term(void) {
    int lies;
    for (lies = 0; lies < 2; lies++) {
        cloth_check_row row[CLOTH_CHECK_ROWS];
        play            p = play_default();
        scene           s;
        script          u;
        loss_user       loss;
        swarm           pull = {4, {0.1, -0.3, 0.2}, 0};
        cloth_term      term = swarm_term(&pull);
        double          worst = 0;
        int             rows = 0, i;
        if (lies) term.vjp = lying_vjp;
        p.steps = 4;
        play_open(&p, &s);
        CHECK(cloth_sim_add_term(s.sim, &term) == CLOTH_OK);
        memset(&loss, 0, sizeof loss);
        loss.nv = s.nv, loss.only = -1;
        u.p = &p, u.s = &s;
        CHECK(cloth_grad_check(s.sim, run, &u, loss_at, &loss, row, &rows, NULL) == CLOTH_OK);
        CHECK(rows > 3);
        for (i = 0; i < rows; i++) {
            const double a = row[i].adjoint, b = row[i].other, most = fmax(fabs(a), fabs(b));
            CHECK_NEAR(row[i].off, fabs(a - b) / most, 1e-14);
            worst = fmax(worst, row[i].off);
        }
        printf("  %s: off by %.1e\n", lies ? "lies" : "true", worst);
        CHECK(lies ? worst > 1e-3 : worst < 1e-6);
        scene_close(&s);
    }
}

static void bad_input(void) {
    cloth_check_row row[CLOTH_CHECK_ROWS];
    play            p = play_default();
    scene           s;
    loss_user       loss;
    cloth_tape     *tape;
    uint64_t        before;
    int             rows = 7, n = 0;
    play_open(&p, &s);
    memset(&loss, 0, sizeof loss);
    loss.nv = s.nv, loss.only = -1;
    before = cloth_sim_hash(s.sim);
    CHECK(cloth_grad_check(NULL, unsteady, &n, loss_at, &loss, row, &rows, NULL) ==
          CLOTH_ERR_ARGUMENT && rows == 0);
    CHECK(cloth_grad_check(s.sim, NULL, &n, loss_at, &loss, row, &rows, NULL) ==
          CLOTH_ERR_ARGUMENT);
    CHECK(cloth_grad_check(s.sim, unsteady, &n, loss_at, &loss, row, &rows, NULL) ==
          CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_hash(s.sim) == before);
    CHECK(cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
    CHECK(cloth_grad_check(s.sim, unsteady, &n, loss_at, &loss, row, &rows, NULL) ==
          CLOTH_ERR_ARGUMENT);
    cloth_tape_destroy(tape);
    scene_close(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(integrators);
    RUN(regions);
    RUN(stitched);
    RUN(contact);
    RUN(later_passes);
    RUN(wrong_term);
    RUN(kinks);
    RUN(bad_input);
    RUN(out_of_memory);
    return TEST_END();
}
