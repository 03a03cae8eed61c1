/* test_grad.c - the derivative of a run: against central differences with Richardson extrapolation
 * in every cause, for every integrator and rung.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_grad.c -o test_grad -lm && ./test_grad */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_grad.h"
#include "test.h"
#include "scene.h"
#include "grad_scene.h"
#include "grad_host.h"

/* --- differences --- */

/* Causes that a play has: their mask. */
static unsigned causes(const play *p) {
    unsigned all = (1u << BY_COUNT) - 1;
    if (!(p->with & WITH_DAMPING)) all &= ~(1u << BY_DAMPING);
    if (!(p->with & WITH_WIND)) all &= ~(1u << BY_WIND);
    if (!(p->with & WITH_ATTACH)) all &= ~(1u << BY_ATTACH | 1u << BY_ATTACH_K);
    if (!(p->with & WITH_FORCE)) all &= ~(1u << BY_FORCE);
    if (!(p->with & WITH_PINS)) all &= ~(1u << BY_PIN);
    if (p->bend == CLOTH_BEND_NONE) all &= ~(1u << BY_THETA0 | 1u << BY_SCALE | 1u << BY_BENDING);
    if (p->bend != CLOTH_BEND_HINGE) all &= ~(1u << BY_THETA0);
    if (p->membrane == CLOTH_MEMBRANE_SPRINGS) all &= ~(1u << BY_POISSON);
    all &= ~(p->given ? 1u << BY_DENSITY : 1u << BY_MASS);
    return all;
}

static double worst;                        /* derivative of a run, against differences         */

static void compare(const play *p, const char *what, int only, double bound) {
    cloth_tape       *tape = NULL;
    cloth_grad_report rep;
    loss_user         u;
    results           r;
    scene             s;
    int               by;
    (void)play_run(p, &s, &tape, only);
    memset(&u, 0, sizeof u);
    u.nv = s.nv;
    u.only = only;
    r = results_make(&s, p->steps);
    CHECK(cloth_tape_steps(tape) == p->steps);
    CHECK(cloth_grad_backward(tape, loss_at, &u, &r.g, &rep) == CLOTH_OK);
    CHECK(rep.valid && u.calls == p->steps + 1);
    if (!rep.valid) printf("  %s: %s, step %d\n", what, rep.why, rep.step);
    for (by = 0; by < BY_COUNT; by++) {
        double a, b;
        if (!(causes(p) >> by & 1)) continue;
        a = results_along(&r, p, by);
        b = play_difference(p, by, p->step, only);
        if (test_full())
            printf("  %-14s %-12s %17.10e %17.10e  %.1e\n", what, by_name[by], a, b,
                   fabs(a - b) / fmax(fabs(a), fabs(b)));
        CHECK_REL(a, b, bound);
        worst = fmax(worst, fabs(a - b) / fmax(fabs(a), fabs(b)));
    }
    results_free(&r);
    cloth_tape_destroy(tape);
    scene_close(&s);
}

static void differences_euler(void) {
    play p = play_default();
    compare(&p, "euler", -1, 1e-6);
    if (test_quick()) return;
    p.ties = 1;
    compare(&p, "euler, ties", -1, 1e-6);
    if (!test_full()) return;
    p.ties = 0;
    p.substeps = 3;
    compare(&p, "euler, 3 sub", -1, 1e-6);
}

static void differences_bdf2(void) {
    play p = play_default();
    p.integrator = CLOTH_INTEGRATOR_BDF2;
    if (test_full() || test_quick()) compare(&p, "bdf2", -1, 1e-6);    /* else taken_again() */
    if (test_quick()) return;
    p.substeps = 2;
    p.given = 1;
    compare(&p, "bdf2, 2 sub", -1, 1e-6);
}

/* A pin that is torn to and fro makes energy from nowhere: some steps of BDF2 are taken again, and
 * they and the next ones are of implicit Euler. What the tape says of them is what was done. */
static void differences_taken_again(void) {
    play  p = play_default();
    scene s;
    int   again = 0;
    p.integrator = CLOTH_INTEGRATOR_BDF2;
    p.h = 0.025;
    p.wobble = 0.04;
    p.again = &again;
    (void)play_run(&p, &s, NULL, -1);
    scene_close(&s);
    CHECK(again >= 4);                      /* the start, the new material, a step and its next */
    p.again = NULL;
    compare(&p, "bdf2, again", -1, 1e-6);
    p.steps = 16;                           /* the last one was: nothing of that is left behind */
    p.step *= 4;                            /* by membrane it all but cancels: less says 6 digits */
    compare(&p, "bdf2, ends so", -1, 1e-6);
}

/* "Time is up" in the seventeenth call of a step. */
static int late(void *user) { return ++*(int *)user >= 17 ? 2 : 0; }

static void speeds_at(int k, const double *x, const double *v, double *gx, double *gv,
                      void *user) {
    int i;
    (void)x, (void)v, (void)gx;
    for (i = 0; k == 16 && i < 3 * *(const int *)user; i++) gv[i] += sin(i);
}

/* That scene, whose last step, of energy from nowhere, has no time to be taken again. */
static double late_run(double dv, double *g_v0, int *valid) {
    play             p = play_default();
    cloth_tape      *tape = NULL;
    cloth_hooks      hooks;
    cloth_attachment extra;
    scene            s;
    double           sum = 0;
    int              k, calls = 0;
    memset(&hooks, 0, sizeof hooks);
    extra.id = 0;
    hooks.cancel.fn = late, hooks.cancel.user = &calls;
    p.integrator = CLOTH_INTEGRATOR_BDF2, p.h = 0.025, p.wobble = 0.04, p.hooks = &hooks;
    play_open(&p, &s);
    cloth_sim_state(s.sim)->v[37] += dv;
    CHECK(!g_v0 || !cloth_tape_create(s.sim, NULL, &tape));
    for (k = 0; k < 16; k++) {
        play_say(&p, &s, &extra, k);
        play_change(&p, &s, k);
        calls = k < 15 ? -1000 : 0;
        CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
    }
    for (k = 0; k < 3 * s.nv; k++) sum += sin(k) * cloth_sim_state(s.sim)->v[k];
    if (g_v0) {
        cloth_grad        g;
        cloth_grad_report rep;
        memset(&g, 0, sizeof g);
        g.v0 = g_v0;
        CHECK(cloth_grad_backward(tape, speeds_at, &s.nv, &g, &rep) == CLOTH_OK);
        *valid = rep.valid;
    }
    cloth_tape_destroy(tape);
    scene_close(&s);
    return sum;
}

static void differences_late(void) {
    double v0[3 * 40];
    int    valid = 0;
    (void)late_run(0, v0, &valid);
    CHECK(valid);
    CHECK_REL(v0[37], (late_run(1e-5, NULL, NULL) - late_run(-1e-5, NULL, NULL)) / 2e-5, 1e-4);
}

/* A loss of x after the fourth step, times by[0], of by[1] numbers. */
static void scaled_at(int k, const double *x, const double *v, double *gx, double *gv,
                      void *user) {
    const double *by = (const double *)user;
    int           i;
    (void)x, (void)v, (void)gv;
    for (i = 0; k == 4 && i < by[1]; i++) gx[i] += by[0] * noise((unsigned)i);
}

/* What early stops cost is relative: the same for losses whose squares are beyond doubles, or 0.
 * (It was not a number at 1e160, which passed for little, and 0 at 1e155 and 1e-170.) */
static void early_of_any_loss(void) {
    static const double scale[5] = {1, 1e155, 1e160, 1e-170, 1e-250};
    play                p = play_default();
    double              x0[3 * 40], first = 0;
    int                 i, strict;
    p.tolerance = 1e-4, p.steps = 4;
    for (i = 0; i < 10; i++) {
        cloth_tape_options o = cloth_tape_options_default();
        cloth_attachment   extra;
        cloth_grad         g;
        cloth_grad_report  rep;
        cloth_tape        *tape = NULL;
        scene              s;
        double             by[2];
        int                k;
        memset(&g, 0, sizeof g);
        extra.id = 0, g.x0 = x0, strict = i % 2;
        if (strict) o.early = 1e-6;
        play_open(&p, &s);
        by[0] = scale[i / 2], by[1] = 3 * s.nv;
        CHECK(cloth_tape_create(s.sim, &o, &tape) == CLOTH_OK);
        for (k = 0; k < p.steps; k++) {
            play_say(&p, &s, &extra, k);
            CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
        }
        CHECK(cloth_grad_backward(tape, scaled_at, by, &g, &rep) == CLOTH_OK);
        if (i == 0) first = rep.early;
        CHECK(rep.early > 1e-5 && rep.valid == !strict);
        CHECK_REL(rep.early, first, 1e-9);
        cloth_tape_destroy(tape);
        scene_close(&s);
    }
}

static void differences_leapfrog(void) {
    play p = play_default();
    p.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    p.substeps = 40;
    compare(&p, "leapfrog", -1, 1e-6);
    if (test_quick()) return;
    p.given = 1;
    p.bend = CLOTH_BEND_QUADRATIC;
    compare(&p, "leapfrog, quad", -1, 1e-6);
}

/* The other rungs; the loss on the last state alone: the adjoint goes all the way. */
static void differences_rungs(void) {
    play p = play_default();
    p.membrane = CLOTH_MEMBRANE_SPRINGS;
    compare(&p, "springs", p.steps, 1e-6);
    if (test_quick()) return;
    p = play_default();
    p.bend = CLOTH_BEND_QUADRATIC;
    p.integrator = CLOTH_INTEGRATOR_BDF2;
    compare(&p, "quadratic", p.steps, 1e-6);
    p = play_default();
    p.bend = CLOTH_BEND_QUADRATIC;
    p.with &= ~WITH_DAMPING;                /* its Hessian is assembled once a run */
    compare(&p, "quad, no damp", p.steps, 1e-6);
    p = play_default();
    p.bend = CLOTH_BEND_NONE;
    p.given = 1;
    compare(&p, "no bending", p.steps, 1e-6);
}

/* --- the product of Hessian and vector against the matrix --- */

static void hessian_times_vector(void) {
    static const cloth_bend_model bend[] = {CLOTH_BEND_HINGE, CLOTH_BEND_QUADRATIC,
                                            CLOTH_BEND_NONE};
    int m, b, damp, i;
    for (m = CLOTH_MEMBRANE_SPRINGS; m <= CLOTH_MEMBRANE_STVK; m++)
        for (b = 0; b < 3; b++)
            for (damp = 0; damp < 2; damp++) {
                clothi_line  line;
                clothi_taped e;
                double      *u, *a, *c, big = 0, off = 0;
                scene        s = scene_make(6, (cloth_membrane)m, bend[b], CLOTH_INTEGRATOR_EULER,
                                            NULL, WITH_NOISE | (damp ? WITH_DAMPING : 0));
                const int    n = 3 * s.nv;
                u = (double *)calloc((size_t)(3 * n), sizeof(double));
                if (!u) exit(2);
                a = u + n, c = a + n;
                memset(&e, 0, sizeof e);
                e.h = 0.01;
                CHECK(cloth_step(s.sim, 0.01, NULL) == CLOTH_OK);
                for (i = 0; i < n; i++)
                    a[i] = s.sim->state.x[i] + 2e-3 * noise((unsigned)i);
                CHECK(clothi_keep(s.sim) == CLOTH_OK);
                CHECK(clothi_line_open(s.sim, &e, 0, 1, a, &line) == CLOTH_OK);
                CHECK(clothi_newton_assemble(s.sim, &line.goal, 1) == CLOTH_OK);
                for (i = 0; i < n; i++) u[i] = noise(50u + (unsigned)i);
                cloth_matrix_mul(s.sim->matrix, NULL, u, a);
                for (i = 0; i < n; i++) a[i] -= line.weight * s.sim->params.mass[i / 3] * u[i];
                clothi_hessian_times(s.sim, &line.goal.e, s.sim->w.x, u, c);
                for (i = 0; i < n; i++) {
                    big = fmax(big, fabs(a[i]));
                    off = fmax(off, fabs(a[i] - c[i]));
                }
                CHECK(off <= 1e-12 * big && big > 0);
                free(u);
                scene_close(&s);
            }
}

/* A step at rest that does not put the sim to sleep is a step like others: its momentum follows
 * v0. */
/* One run of p, its gradient by this method to this residual; `squeeze`: it starts in folds of its
 * plane, with one iteration a step, so that its steps end where H is not definite. */
static results by_method(const play *p, cloth_linear method, double tolerance, int squeeze,
                         cloth_grad_report *rep) {
    cloth_tape_options o = cloth_tape_options_default();
    cloth_attachment   extra;
    cloth_tape        *tape = NULL;
    results            r;
    scene              s;
    int                k;
    extra.id = 0;
    play_desc(p, &s);
    s.desc.max_newton = squeeze;
    CHECK(scene_open(&s, p->with & ~WITH_ATTACH) == CLOTH_OK);
    for (k = 0; k < s.nv && squeeze; k++) cloth_sim_state(s.sim)->x[3 * k] *= 0.7;
    cloth_sim_state_changed(s.sim);
    o.linear = method, o.tolerance = tolerance;
    CHECK(cloth_tape_create(s.sim, &o, &tape) == CLOTH_OK);
    for (k = 0; k < p->steps; k++) {
        if (!squeeze) play_say(p, &s, &extra, k);
        CHECK(cloth_step(s.sim, p->h, NULL) == CLOTH_OK);
    }
    r = results_make(&s, p->steps);
    backward(tape, &s, &r, rep);
    cloth_tape_destroy(tape);
    scene_close(&s);
    return r;
}

static double apart(const results *a, const results *b) {
    double big = 0, off = 0;
    int    i;
    for (i = 0; i < a->n[BY_X0]; i++) {
        big = fmax(big, fabs(a->array[BY_X0][i]));
        off = fmax(off, fabs(a->array[BY_X0][i] - b->array[BY_X0][i]));
    }
    return off / big;
}

/* Each method that a tape may be given, to what it is asked for; and to more than one solve can do,
 * which is said. */
static void methods(void) {
    static const cloth_linear kind[4] = {CLOTH_LINEAR_AUTO, CLOTH_LINEAR_JACOBI, CLOTH_LINEAR_SGS,
                                         CLOTH_LINEAR_CHOLESKY};
    cloth_grad_report rep;
    results           first, r;
    play              p = play_default();
    int               k;
    p.with &= ~WITH_ATTACH;
    p.steps = 5;
    first = by_method(&p, CLOTH_LINEAR_AUTO, 1e-10, 0, &rep);
    for (k = 0; k < 4; k++) {
        const int direct = k % 3 == 0;
        r = by_method(&p, kind[k], 1e-8, 0, &rep);
        CHECK(rep.valid && rep.residual <= 1e-8 && (rep.factorizations > 0) == direct);
        CHECK((rep.iterations > 0) != direct && apart(&r, &first) < 1e-6);
        results_free(&r);
        r = by_method(&p, kind[k], 1e-30, 0, &rep);
        CHECK(rep.doubt == CLOTH_GRAD_RESIDUAL && strstr(rep.why, "tolerance") != NULL);
        CHECK(rep.residual < 1e-14 && apart(&r, &first) < 1e-8);
        results_free(&r);
    }
    results_free(&first);
}

/* A step that ends where its Hessian is not definite is solved by factors, whatever was asked for,
 * and is in doubt. */
static void saddles(void) {
    cloth_grad_report rep;
    results           first, r;
    play              p = play_default();
    p.with = 0, p.steps = 2, p.h = 0.1;
    first = by_method(&p, CLOTH_LINEAR_CHOLESKY, 1e-10, 1, &rep);
    CHECK((rep.doubt & CLOTH_GRAD_SADDLE) && rep.negative > 0 && !rep.valid);
    CHECK(strstr(rep.why, "negative curvature") != NULL);
    r = by_method(&p, CLOTH_LINEAR_SGS, 1e-10, 1, &rep);
    CHECK((rep.doubt & CLOTH_GRAD_SADDLE) && rep.factorizations > 0);
    CHECK(rep.residual <= 1e-10 && apart(&r, &first) < 1e-6);
    results_free(&r);
    results_free(&first);
}

static void momentum_at(int k, const double *x, const double *v, double *gx, double *gv,
                        void *user) {
    const scene *s = (const scene *)user;
    int          i;
    (void)x, (void)v, (void)gx;
    for (i = 0; k == 2 && i < s->nv; i++) gv[3 * i] += s->sim->params.mass[i];
}

static void starts_at_rest(void) {
    cloth_tape       *tape = NULL;
    cloth_grad        g;
    cloth_grad_report rep;
    scene             s;
    double           *v0;
    int               k, i;
    for (k = 0; k < 4; k++) {
        scene_desc(&s, 4, NULL, 0);
        s.desc.gravity[1] = 0, s.desc.sleep = k % 2;
        s.desc.integrator = k > 1 ? CLOTH_INTEGRATOR_BDF2 : CLOTH_INTEGRATOR_EULER;
        CHECK(scene_open(&s, 0) == CLOTH_OK && !cloth_tape_create(s.sim, NULL, &tape));
        for (i = 0; i < 2; i++) CHECK(cloth_step(s.sim, 0.01, NULL) == CLOTH_OK);
        v0 = (double *)calloc(3 * (size_t)s.nv, sizeof *v0);
        memset(&g, 0, sizeof g);
        g.v0 = v0;
        CHECK(cloth_grad_backward(tape, momentum_at, &s, &g, &rep) == CLOTH_OK && rep.valid);
        for (i = 0; i < s.nv; i++) CHECK_REL(v0[3 * i], s.sim->params.mass[i], 1e-6);
        free(v0);
        cloth_tape_destroy(tape);
        scene_close(&s);
    }
}

/* How far a row of speeds is from a change is told in metres, over the substep. */
static void margin_in_metres(void) {
    double            v[300] = {0};
    cloth_grad_report rep;
    cloth_contact_row r;
    clothi_grad       g;
    clothi_rows       q;
    scene             s;
    scene_desc(&s, 4, NULL, 0);
    CHECK(scene_open(&s, 0) == CLOTH_OK && s.nv <= 100);
    memset(&g, 0, sizeof g);
    memset(&q, 0, sizeof q);
    memset(&r, 0, sizeof r);
    memset(&rep, 0, sizeof rep);
    g.s = s.sim, g.rep = &rep, rep.margin = HUGE_VAL;
    r.n = 1, r.v[0] = 5, r.w[0] = 1, r.normal[1] = 1, r.multiplier = 1, r.speed = 1;
    v[16] = -2;
    clothi_row_margin(&g, &q, 0, &r, v, 1, 0.01);
    CHECK_NEAR(rep.margin, 0.03, 1e-15);
    scene_close(&s);
}

/* Masses are proportional to the density: what they are worth goes there whole, also that of a
 * vertex of no face, which is as heavy as the first corner. */
static void lumped_masses(void) {
    static const double X[15] = {0, 0, 0, 0.1, 0, 0, 0, 0, -0.1, 5, 5, 5, 0.1, 0, -0.1};
    static const int    F[6] = {0, 1, 2, 1, 4, 2};
    double              mass[5], by = 0, sum = 0;
    cloth_grad          out;
    clothi_grad         g;
    scene               s;
    int                 i;
    scene_desc(&s, 3, NULL, 0);
    s.desc.nv = 5, s.desc.nf = 2, s.desc.x_rest = X, s.desc.faces = F;
    CHECK(scene_open(&s, 0) == CLOTH_OK);
    memset(&g, 0, sizeof g);
    memset(&out, 0, sizeof out);
    for (i = 0; i < 5; i++) mass[i] = noise((unsigned)i), sum += mass[i] * s.sim->params.mass[i];
    out.density = &by, g.out = &out, g.s = s.sim, g.mass = mass;
    clothi_grad_lumped(&g);
    CHECK_REL(by * s.desc.material.density, sum, 1e-12);
    scene_close(&s);
}

/* dL/d{Y, nu} at a material from dL/d{mu, lambda, D} = 1: against differences of what the material
 * gives, for plane stress and strain, with D given and derived. */
static void material_derivatives(void) {
    static const double one[1] = {1};
    double              by[2], v[2], mu, lambda;
    cloth_grad          out;
    clothi_grad         g;
    int                 k, at, i;
    for (k = 0; k < 4; k++) {
        cloth_material m = cloth_material_default();
        m.membrane = 300, m.poisson = 0.2, m.thickness = 0.5, m.bending = k & 1 ? -1 : 1e-4;
        m.plane = k & 2 ? CLOTH_PLANE_STRAIN_3D : CLOTH_PLANE_STRESS;
        memset(&g, 0, sizeof g);
        memset(&out, 0, sizeof out);
        memset(by, 0, sizeof by);
        out.membrane = by, out.poisson = by + 1, g.out = &out;
        g.mu = g.lambda = g.bending = (double *)(uintptr_t)one;
        clothi_grad_material(&g, &m, 0);
        for (at = 0; at < 2; at++) {
            double *const p = at ? &m.poisson : &m.membrane, eps = at ? 1e-5 : 1e-2;
            for (i = 0; i < 2; i++) {
                *p += i ? -2 * eps : eps;
                cloth_material_lame(&m, &mu, &lambda);
                v[i] = mu + lambda + cloth_material_rigidity(&m);
            }
            *p += eps;
            CHECK_REL(by[at], (v[0] - v[1]) / (2 * eps), 1e-7);
        }
    }
}

/* --- statics --- */

/* Derivative of value(p) along the direction of `by`: central differences at halved steps, once
 * extrapolated; of those the one that differs least from the last. */
static double rest_difference(double (*value)(const play *p), play p, int by, double eps) {
    double d[GRAD_LEVELS][2], best = 0, off = HUGE_VAL;
    int    i;
    p.by = by;
    for (i = 0; i < GRAD_LEVELS; i++, eps *= 0.5) {
        double v;
        p.eps = eps;
        v = value(&p);
        p.eps = -eps;
        d[i][0] = (v - value(&p)) / (2 * eps);
        d[i][1] = i ? (4 * d[i][0] - d[i - 1][0]) / 3 : 0;
        if (i > 1 && fabs(d[i][1] - d[i - 1][1]) < off)
            off = fabs(d[i][1] - d[i - 1][1]), best = d[i][1];
    }
    return best;
}

/* What was before the rest does not matter, what the cloth is made of does. */
static void rest_compare(double (*value)(const play *p), const play *p, const results *r,
                         double eps, const char *what) {
    int by;
    for (by = 0; by < BY_COUNT; by++) {
        const double a = results_along(r, p, by);
        double       b = 0;
        if (!(causes(p) >> by & 1)) continue;
        if (by == BY_X0 || by == BY_V0) {
            CHECK(!(fabs(a) > 0));
            continue;
        }
        b = rest_difference(value, *p, by, eps);
        if (test_full())
            printf("  %-15s %-12s %17.10e %17.10e  %.1e\n", what, by_name[by], a, b,
                   fabs(a - b) / fmax(fabs(a), fabs(b)));
        CHECK_REL(a, b, 1e-6);
    }
}

static double rest_shape[1200];             /* where the next static_run() begins             */

static double static_run(const play *p, scene *s, cloth_tape **tape, int from_rest) {
    loss_user u;
    memset(&u, 0, sizeof u);
    u.only = -1;
    play_open(p, s);
    play_say(p, s, NULL, 0);
    u.nv = s->nv;
    if (from_rest)
        memcpy(cloth_sim_state(s->sim)->x, rest_shape, 3 * (size_t)s->nv * sizeof(double));
    cloth_sim_state_changed(s->sim);
    if (tape) CHECK(cloth_tape_create(s->sim, NULL, tape) == CLOTH_OK);
    CHECK(cloth_solve_static(s->sim, NULL) == CLOTH_OK);
    loss_at(1, cloth_sim_state(s->sim)->x, cloth_sim_state(s->sim)->v, NULL, NULL, &u);
    return u.value;
}

static double static_value(const play *p) {
    scene  s;
    double value = static_run(p, &s, NULL, 1);
    scene_close(&s);
    return value;
}

/* A hanging cloth at rest. */
static void statics(play p, int wind, const char *what) {
    cloth_tape       *tape = NULL;
    cloth_grad_report rep;
    loss_user         u;
    results           r;
    scene             s;
    p.with = WITH_PINS | WITH_ATTACH | WITH_FORCE | (wind ? WITH_WIND : 0);
    p.still = 1;
    p.calm = wind ? 0.3 : 1;
    p.steps = 1;
    (void)static_run(&p, &s, NULL, 0);
    memcpy(rest_shape, cloth_sim_state(s.sim)->x, 3 * (size_t)s.nv * sizeof(double));
    scene_close(&s);
    (void)static_run(&p, &s, &tape, 1);
    memset(&u, 0, sizeof u);
    u.nv = s.nv;
    u.only = 1;
    r = results_make(&s, 1);
    CHECK(cloth_grad_backward(tape, loss_at, &u, &r.g, &rep) == CLOTH_OK && rep.valid);
    rest_compare(static_value, &p, &r, 0.4, what);
    results_free(&r);
    cloth_tape_destroy(tape);
    scene_close(&s);
}

static void differences_static(void) {
    play p = play_default();
    statics(p, 0, "static");
    statics(p, 1, "static, wind");
    if (test_quick()) return;
    p.ties = 1;
    statics(p, 0, "static, ties");
    p = play_default();
    p.integrator = CLOTH_INTEGRATOR_BDF2;
    p.membrane = CLOTH_MEMBRANE_SPRINGS;
    p.given = 1;
    statics(p, 0, "static, springs");
    p = play_default();
    p.bend = CLOTH_BEND_QUADRATIC;
    statics(p, 1, "static, quad");
}

/* Steps, a rest, steps; the loss is of what comes after the rest. */
static void rested_loss(int k, const double *x, const double *v, double *gx, double *gv,
                        void *user) {
    if (k > 2) loss_at(k, x, v, gx, gv, user);
}

static double rested_run(const play *p, scene *s, cloth_tape **tape) {
    loss_user u;
    int       k;
    memset(&u, 0, sizeof u);
    u.only = -1;
    play_open(p, s);
    u.nv = s->nv;
    if (tape) CHECK(cloth_tape_create(s->sim, NULL, tape) == CLOTH_OK);
    for (k = 0; k < p->steps; k++) {
        play_say(p, s, NULL, k);
        if (k == 2) CHECK(cloth_solve_static(s->sim, NULL) == CLOTH_OK);
        else CHECK(cloth_step(s->sim, p->h, NULL) == CLOTH_OK);
        rested_loss(k + 1, cloth_sim_state(s->sim)->x, cloth_sim_state(s->sim)->v, NULL, NULL, &u);
    }
    return u.value;
}

static double rested_value(const play *p) {
    scene  s;
    double value = rested_run(p, &s, NULL);
    scene_close(&s);
    return value;
}

static void static_in_a_run(void) {
    play              p = play_default();
    cloth_tape       *tape = NULL;
    cloth_grad_report rep;
    loss_user         u;
    results           r;
    scene             s;
    p.with = WITH_PINS | WITH_DAMPING | WITH_FORCE;
    p.steps = 6;
    (void)rested_run(&p, &s, &tape);
    memset(&u, 0, sizeof u);
    u.nv = s.nv;
    u.only = -1;
    r = results_make(&s, p.steps);
    CHECK(cloth_grad_backward(tape, rested_loss, &u, &r.g, &rep) == CLOTH_OK && rep.valid);
    rest_compare(rested_value, &p, &r, 0.1, "rested");
    results_free(&r);
    cloth_tape_destroy(tape);
    scene_close(&s);
}

/* --- a host's own term and its parameter --- */

static double swarm_run(const play *p, swarm *u, cloth_grad_report *rep) {
    cloth_term  term;
    cloth_tape *tape = NULL;
    cloth_grad  g;
    loss_user   l;
    scene       s;
    int         k;
    memset(&l, 0, sizeof l);
    memset(&g, 0, sizeof g);
    term = swarm_term(u);
    play_open(p, &s);
    CHECK(cloth_sim_add_term(s.sim, &term) == CLOTH_OK);
    CHECK(cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
    for (k = 0; k < p->steps; k++) CHECK(cloth_step(s.sim, p->h, NULL) == CLOTH_OK);
    l.nv = s.nv, l.only = p->steps;
    loss_at(p->steps, cloth_sim_state(s.sim)->x, cloth_sim_state(s.sim)->v, NULL, NULL, &l);
    if (rep) CHECK(cloth_grad_backward(tape, loss_at, &l, &g, rep) == CLOTH_OK && rep->valid);
    cloth_tape_destroy(tape);
    scene_close(&s);
    return l.value;
}

static void host_term_by(cloth_integrator by, int substeps) {
    cloth_grad_report rep;
    play   p = play_default();
    swarm  u = {4, {0.1, -0.3, 0.2}, 0};
    double k = u.k, d[3];
    int    i;
    p.integrator = by;
    p.substeps = substeps;
    p.steps = 5;                            /* later it buckles */
    (void)swarm_run(&p, &u, &rep);
    for (i = 0; i < 3; i++) {
        double eps = 0.002 / (1 << (2 * i)), v;
        swarm  w = u;
        w.k = k + eps;
        v = swarm_run(&p, &w, NULL);
        w.k = k - eps;
        d[i] = (v - swarm_run(&p, &w, NULL)) / (2 * eps);
    }
    for (i = 0; i < 2; i++) d[i] = (16 * d[i + 1] - d[i]) / 15;
    CHECK_REL(u.dk, (256 * d[1] - d[0]) / 255, 1e-6);
}

static void host_term(void) {
    host_term_by(CLOTH_INTEGRATOR_BDF2, 0);
    host_term_by(CLOTH_INTEGRATOR_LEAPFROG, 40);
}

/* --- statics with a force that a host takes from x^n --- */

typedef struct tide {                       /* F = -k sin(8 x^n), by axes                      */
    double k, dk;
} tide;

static cloth_status tide_eval(void *user, const cloth_eval *e, double *energy) {
    int i;
    for (i = 0, *energy = 0; i < 3 * e->nv; i++) {
        const double f = ((const tide *)user)->k * sin(8 * e->x_n[i]);
        *energy += f * e->x[i];
        if (e->grad) e->grad[i] += f;
    }
    return CLOTH_OK;
}

static cloth_status tide_vjp(void *user, const cloth_eval *e, const double *a, cloth_vjp *out) {
    tide *u = (tide *)user;
    int   i;
    for (i = 0; i < 3 * e->nv; i++) {
        if (out->own) u->dk += a[i] * sin(8 * e->x_n[i]);
        if (out->x_n) out->x_n[i] += a[i] * 8 * u->k * cos(8 * e->x_n[i]);
    }
    return CLOTH_OK;
}

/* The loss of a sheet that hangs on two corners; again: m, how far statics moves what it left. */
static double tide_run(tide *u, int wind, cloth_grad_report *rep, double *again) {
    play        p = play_default();
    cloth_term  term;
    cloth_tape *tape = NULL;
    cloth_grad  g;
    loss_user   l;
    scene       s;
    double     *x;
    int         i;
    memset(&l, 0, sizeof l), memset(&g, 0, sizeof g), memset(&term, 0, sizeof term);
    p.with = WITH_PINS | (wind ? WITH_WIND : 0);
    p.calm = wind ? 0.3 : 1;
    play_open(&p, &s);
    term.name = "tide", term.user = u, term.eval = tide_eval, term.vjp = tide_vjp;
    CHECK(cloth_sim_add_term(s.sim, &term) == CLOTH_OK);
    CHECK(cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
    CHECK(cloth_solve_static(s.sim, NULL) == CLOTH_OK);
    x = cloth_sim_state(s.sim)->x;
    l.nv = s.nv, l.only = 1;
    loss_at(1, x, cloth_sim_state(s.sim)->v, NULL, NULL, &l);
    if (rep) CHECK(cloth_grad_backward(tape, loss_at, &l, &g, rep) == CLOTH_OK && rep->valid);
    for (i = 0; again && i < 3 * s.nv; i++) again[i] = x[i];
    if (again) CHECK(cloth_solve_static(s.sim, NULL) == CLOTH_OK);
    for (i = 0; again && i < 3 * s.nv; i++)
        again[0] = fmax(i ? again[0] : 0, fabs(x[i] - again[i]));
    cloth_tape_destroy(tape);
    scene_close(&s);
    return l.value;
}

/* What a term lags in statics is lagged to x itself, as wind is: a second call moves nothing, and
 * the derivative knows. (H z <- a - W'z grew to 1e27 here.) */
static void lagged_static(void) {
    double again[3 * 64];
    int    wind, i;
    for (wind = 0; wind < 2; wind++) {
        cloth_grad_report rep;
        tide   u = {3e-3, 0};
        double d[2];
        (void)tide_run(&u, wind, &rep, again);
        CHECK(again[0] < 1e-9);
        for (i = 0; i < 2; i++) {
            tide   w = u;
            double eps = 1e-5 / (1 << i), v;
            w.k += eps;
            v = tide_run(&w, wind, NULL, NULL);
            w.k -= 2 * eps;
            d[i] = (v - tide_run(&w, wind, NULL, NULL)) / (2 * eps);
        }
        CHECK_REL(u.dk, (4 * d[1] - d[0]) / 3, 1e-6);
    }
}

static void corner_at(int k, const double *x, const double *v, double *gx, double *gv,
                      void *user) {
    (void)x, (void)v, (void)gv;
    if (k == 4) gx[3 * *(const int *)user + 1] += 1;
}

/* Cloth at rest, held by an attachment where it is, as a fit begins: the pose is the point of the
 * cloth to the last bit and is the last target all the same. (It was taken for a new one.) */
static void rests_at_target(void) {
    static const double corner[3] = {1, 0, 0};
    int                 kind, by, end;
    for (kind = 0; kind < 2; kind++)
        for (by = 0; by < 4; by++) {
            double attach[4 * 3], y[2];
            for (end = 0; end < 2; end++) {
                cloth_tape      *tape = NULL;
                cloth_attachment id;
                cloth_grad       g;
                scene            s;
                double           to[3];
                int              k, v;
                scene_desc(&s, 3, NULL, 0);
                s.desc.gravity[1] = 0, s.desc.max_attachments = 1, s.desc.tolerance = 1e-12;
                s.desc.membrane = CLOTH_MEMBRANE_SPRINGS, s.desc.bend = CLOTH_BEND_NONE;
                s.desc.integrator = kind ? CLOTH_INTEGRATOR_EULER : CLOTH_INTEGRATOR_LEAPFROG;
                s.desc.substeps = kind ? 3 : 0;
                CHECK(scene_open(&s, 0) == CLOTH_OK);
                v = s.mesh->faces[0];
                memcpy(to, s.mesh->x + 3 * v, sizeof to);
                CHECK(cloth_sim_attach(s.sim, 0, corner, 20, to, &id) == CLOTH_OK);
                if (!end) CHECK(!cloth_tape_create(s.sim, NULL, &tape));
                for (k = 0; k < 4; k++) {
                    to[1] = s.mesh->x[3 * v + 1] + (k == by ? end * 1e-4 : 0);
                    CHECK(cloth_sim_attach_move(s.sim, id, to) == CLOTH_OK);
                    CHECK(cloth_step(s.sim, 0.01, NULL) == CLOTH_OK);
                }
                y[end] = cloth_sim_state(s.sim)->x[3 * v + 1];
                memset(&g, 0, sizeof g);
                g.attach = attach;
                if (tape) CHECK(!cloth_grad_backward(tape, corner_at, &v, &g, NULL));
                cloth_tape_destroy(tape);
                scene_close(&s);
            }
            CHECK_REL(attach[3 * by + 1], (y[1] - y[0]) / 1e-4, 1e-4);
        }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(differences_euler);
    RUN(differences_bdf2);
    RUN(differences_taken_again);
    RUN(differences_late);
    RUN(early_of_any_loss);
    RUN(differences_leapfrog);
    RUN(differences_rungs);
    RUN(differences_static);
    RUN(static_in_a_run);
    RUN(hessian_times_vector);
    RUN(methods);
    RUN(saddles);
    RUN(starts_at_rest);
    RUN(rests_at_target);
    RUN(margin_in_metres);
    RUN(lumped_masses);
    RUN(material_derivatives);
    RUN(host_term);
    RUN(lagged_static);
    printf("  derivatives of runs by each cause: off by at most %.1e\n", worst);
    return TEST_END();
}
