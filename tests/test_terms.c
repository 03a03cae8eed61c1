/* test_terms.c - every energy term: gradient against differences of the value, Hessian against
 * differences of the gradient, vjp against differences by each thing it differentiates; wind,
 * damping, ties, pins and a host's own term do what they promise.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_terms.c -o test_terms -lm && ./test_terms */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include "test.h"
#include "scene.h"

#define MOST 400                            /* scalars of a small sheet                        */

static scene       S;
static clothi_goal goal;
static double      X0[MOST];                /* where the terms are evaluated                   */

/* 2 regions, masses as given, everything switched on, x away from x_n. */
static void open_scene(cloth_membrane membrane, cloth_bend_model bend, int with) {
    static int            region[100];
    static cloth_material two[2];
    static double         mass[MOST];
    cloth_params         *p;
    int                   i;
    scene_close(&S);
    scene_desc(&S, 4, NULL, with);
    for (i = 0; i < S.desc.nf; i++) region[i] = i % 3 == 0;
    for (i = 0; i < S.nv; i++) mass[i] = 2e-3 + 1e-3 * noise(900u + (unsigned)i);
    two[0] = two[1] = S.desc.material;
    two[1].membrane = 77.0;
    two[1].poisson = 0.1;
    two[1].bending = 3e-3;
    two[0].bending = 1e-3;
    if (with & WITH_DAMPING) two[1].damping = 5e-3;
    S.desc.region = region;
    S.desc.nregions = 2;
    S.desc.materials = two;
    S.desc.vertex_mass = mass;
    S.desc.membrane = membrane;
    S.desc.bend = bend;
    S.desc.lift = 0.3;
    if (scene_open(&S, with)) exit(2);
    p = cloth_sim_params(S.sim);
    for (i = 0; i < p->nh; i++) {
        p->hinge_scale[i] = 1 + 0.3 * noise(50u + (unsigned)i);
        if (bend == CLOTH_BEND_HINGE) p->theta0[i] = 0.2 * noise(150u + (unsigned)i);
    }
    for (i = 0; i < 6 * p->nf; i++) p->X[i] += 0.004 * noise(250u + (unsigned)i);
    if (cloth_sim_params_changed(S.sim)) exit(2);
    for (i = 0; i < 3 * S.nv; i++) {
        X0[i] = S.sim->state.x[i] + 0.01 * noise(400u + (unsigned)i);
        S.sim->state.v[i] = 0.5 * noise(600u + (unsigned)i);
    }
}

/* Lags the terms to the state for a substep of h and inertia 1/eta^2 (0: none). */
static void lag(double h, double eta) {
    CHECK(clothi_need_work(S.sim) == CLOTH_OK);
    clothi_eval_start(S.sim, &goal, h);
    goal.eta = eta;
    memcpy(S.sim->w.y, S.sim->state.x, 3 * (size_t)S.nv * sizeof(double));
    clothi_input(S.sim, h, 0.4, 0.7);
    CHECK(clothi_terms_begin(S.sim, &goal) == CLOTH_OK);
}

static double value_at(const double *x, double *grad) {
    double value = NAN;
    CHECK(clothi_objective(S.sim, &goal, x, grad, 0, 0, &value) == CLOTH_OK);
    return value;
}

/* d f/dt by central differences, error O(step^4). */
#define DIFFERENCE(f, step)                                                                      \
    ((8 * (f(step) - f(-(step))) - (f(2 * (step)) - f(-2 * (step)))) / (12 * (step)))

static double along_x[MOST], along_d[MOST];

static double along(double t) {
    double x[MOST];
    int    i;
    for (i = 0; i < 3 * S.nv; i++) x[i] = along_x[i] + t * along_d[i];
    return value_at(x, NULL);
}

/* Gradient at x against differences of the value, coordinate by coordinate and across. */
static void check_gradient(const double *x) {
    double g[MOST], big = 0, worst = 0;
    int    i, j, n = 3 * S.nv;
    value_at(x, g);
    for (i = 0; i < n; i++) big = fmax(big, fabs(g[i]));
    memcpy(along_x, x, (size_t)n * sizeof(double));
    for (j = 0; j < n + 3; j++) {
        double dot = 0, fd;
        for (i = 0; i < n; i++) {
            along_d[i] = j < n ? i == j : noise((unsigned)(1000 * j + i));
            dot += g[i] * along_d[i];
        }
        fd = DIFFERENCE(along, 2e-4);
        worst = fmax(worst, fabs(fd - dot));
    }
    if (!(worst <= 1e-7 * big)) printf("  gradient: %g of %g\n", worst, big);
    CHECK(worst <= 1e-7 * big);
}

/* Dense copy of the matrix. */
static void dense(double *H) {
    int i, j, n = 3 * S.nv;
    for (i = 0; i < n; i++)
        for (j = 0; j < n; j++) {
            const cloth_matrix *A = S.sim->matrix;
            int slot = clothi_pattern_slot(A->p, i / 3, j / 3);
            if (i / 3 == j / 3)
                H[i * n + j] = A->diag[9 * A->p->row_of[i / 3] + 3 * (i % 3) + j % 3];
            else if (slot >= 0)
                H[i * n + j] = A->low[9 * (slot >> 1) + (slot & 1 ? 3 * (j % 3) + i % 3
                                                                  : 3 * (i % 3) + j % 3)];
            else
                H[i * n + j] = 0;
        }
}

static void check_hessian(const double *x) {
    int     i, j, n = 3 * S.nv;
    double *H = (double *)malloc((size_t)n * (size_t)n * sizeof(double));
    double  xt[MOST], ga[MOST], gb[MOST], gc[MOST], gd[MOST], value, big = 0, worst = 0;
    const double e = 2e-4;
    CHECK(clothi_objective(S.sim, &goal, x, ga, 1, 0, &value) == CLOTH_OK);
    dense(H);
    for (i = 0; i < n * n; i++) big = fmax(big, fabs(H[i]));
    memcpy(xt, x, (size_t)n * sizeof(double));
    for (j = 0; j < n; j++) {
        xt[j] = x[j] + e;
        value_at(xt, ga);
        xt[j] = x[j] - e;
        value_at(xt, gb);
        xt[j] = x[j] + 2 * e;
        value_at(xt, gc);
        xt[j] = x[j] - 2 * e;
        value_at(xt, gd);
        xt[j] = x[j];
        for (i = 0; i < n; i++)
            worst = fmax(worst, fabs((8 * (ga[i] - gb[i]) - (gc[i] - gd[i])) / (12 * e) -
                                     H[i * n + j]));
    }
    if (!(worst <= 1e-6 * big)) printf("  hessian: %g of %g\n", worst, big);
    CHECK(worst <= 1e-6 * big);
    free(H);
}

#define FOR_RUNGS(m, b)                                                                          \
    for (m = (int)CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++)                    \
        for (b = (int)CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++)

static void gradients_and_hessians(void) {
    static const int masks[3] = {WITH_NOISE, WITH_NOISE | WITH_DAMPING, WITH_ALL};
    int m, b, k;
    FOR_RUNGS(m, b)
        for (k = 0; k < 3; k++) {
            open_scene((cloth_membrane)m, (cloth_bend_model)b, masks[k]);
            lag(0.01, 0.02);
            check_gradient(X0);
            check_hessian(X0);
            lag(0, 0);                      /* statics: no inertia, no damping, wind constant */
            check_gradient(X0);
            check_hessian(X0);
        }
}

/* --- the public path --- */

static double potential_at(const double *x, double *g) {
    double e = NAN;
    CHECK(cloth_sim_potential(S.sim, x, &e, g) == CLOTH_OK);
    return e;
}

static double potential_along(double t) {
    double x[MOST];
    int    i;
    for (i = 0; i < 3 * S.nv; i++) x[i] = along_x[i] + t * along_d[i];
    return potential_at(x, NULL);
}

static cloth_status failing(void *user, const cloth_eval *e, double *energy) {
    *energy = 0;
    if (e->grad) e->grad[4] += 1;
    return *(int *)user ? CLOTH_ERR_IO : CLOTH_OK;
}

/* Not finite, or a host's term gives up: value and gradient stay as they were. */
static void potential_fails(void) {
    cloth_ledger l;
    cloth_term   term;
    double       g[MOST], x[MOST], value = 5;
    int          fails = 1, i;
    memset(&term, 0, sizeof term);
    term.name = "failing", term.user = &fails, term.eval = failing;
    memcpy(x, X0, sizeof x);
    for (i = 0; i < MOST; i++) g[i] = 3;
    x[5] = NAN;
    CHECK(cloth_sim_potential(S.sim, x, &value, g) == CLOTH_ERR_NONFINITE);
    x[5] = 1e100;
    CHECK(cloth_sim_potential(S.sim, x, &value, g) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
    CHECK(cloth_sim_potential(S.sim, X0, &value, g) == CLOTH_ERR_IO);
    CHECK(cloth_sim_energy(S.sim, &l) == CLOTH_ERR_IO);
    for (i = 0; i < MOST; i++) CHECK(g[i] == 3);
    CHECK(value == 5);
    fails = 0;
    CHECK(cloth_sim_potential(S.sim, X0, &value, g) == CLOTH_OK && value != 5);
    CHECK(cloth_sim_energy(S.sim, &l) == CLOTH_OK);
    S.sim->state.v[7] = NAN;
    CHECK(cloth_sim_energy(S.sim, &l) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_potential(S.sim, X0, &value, g) == CLOTH_ERR_NONFINITE);
    S.sim->state.v[7] = 1e200;
    CHECK(cloth_sim_energy(S.sim, &l) == CLOTH_ERR_NONFINITE && !(l.total > 0));
    /* what a refused step left in scratch counts for nothing */
    S.sim->state.v[7] = 1e308;
    cloth_sim_state_changed(S.sim);
    CHECK(cloth_step(S.sim, 100, NULL) != CLOTH_OK);
    S.sim->state.v[7] = 0;
    cloth_sim_state_changed(S.sim);
    CHECK(cloth_sim_potential(S.sim, X0, &value, g) == CLOTH_OK);
}

static void potential_is_consistent(void) {
    static const double  none[3] = {0, 0, 0};
    static unsigned char buf[1 << 15];
    double               g[MOST], again[MOST], big = 0, worst = 0, first;
    cloth_ledger         l[2];
    int                  m, b, i, j, n;
    FOR_RUNGS(m, b) {
        double   fall = 0;
        uint64_t hash;
        open_scene((cloth_membrane)m, (cloth_bend_model)b, WITH_ALL);
        n = 3 * S.nv;
        hash = cloth_sim_hash(S.sim);
        first = potential_at(X0, g);
        memcpy(along_x, X0, sizeof X0);
        big = worst = 0;
        for (i = 0; i < n; i++) big = fmax(big, fabs(g[i]));
        for (j = 0; j < n; j++) {
            for (i = 0; i < n; i++) along_d[i] = i == j;
            worst = fmax(worst, fabs(DIFFERENCE(potential_along, 2e-4) - g[j]));
        }
        CHECK(worst <= 1e-7 * big);
        CHECK(hash == cloth_sim_hash(S.sim));
        /* what a step leaves in scratch does not show, what a host sets after it does */
        CHECK(cloth_sim_save_size(S.sim) <= sizeof buf);
        CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.003, NULL) == CLOTH_OK);
        CHECK(cloth_sim_restore(S.sim, buf, sizeof buf) == CLOTH_OK);
        CHECK(first == potential_at(X0, again) && memcmp(g, again, (size_t)n * 8) == 0);
        CHECK(cloth_sim_energy(S.sim, &l[0]) == CLOTH_OK);
        CHECK(cloth_sim_set_gravity(S.sim, none) == CLOTH_OK);
        for (j = 0; j < n; j++) {
            const double f = S.sim->params.mass[j / 3] * S.desc.gravity[j % 3];
            first += f * X0[j], fall += f * S.sim->state.x[j];
        }
        CHECK_REL(potential_at(X0, NULL), first, 1e-12);
        CHECK(cloth_sim_energy(S.sim, &l[1]) == CLOTH_OK);
        CHECK_REL(l[1].total, l[0].total + fall, 1e-12);
    }
    CHECK(cloth_sim_potential(S.sim, NULL, NULL, g) == CLOTH_ERR_ARGUMENT);
    potential_fails();
    CHECK(cloth_sim_potential(NULL, X0, NULL, g) == CLOTH_ERR_ARGUMENT);
}

/* --- vjp --- */

static double A[MOST], H_STEP;
static double lame[2][2];                   /* mu, lambda of each region                       */
static double *knob;
static double  knob_start;

/* a . grad of all terms with everything derived and lagged anew. */
static double pulled(void) {
    double g[MOST], sum = 0;
    int    i, r;
    for (r = 0; r < 2; r++) {               /* membrane and poisson that have this mu, lambda */
        cloth_material *mat = S.sim->params.material + r;
        mat->poisson = lame[r][1] / (lame[r][1] + 2 * lame[r][0]);
        mat->membrane = 2 * lame[r][0] * (1 + mat->poisson);
    }
    clothi_derive(S.sim);
    lag(H_STEP, 0);
    value_at(X0, g);
    for (i = 0; i < 3 * S.nv; i++) sum += A[i] * g[i];
    return sum;
}

static double turned(double t) {
    double v;
    *knob = knob_start + t;
    v = pulled();
    *knob = knob_start;
    return v;
}

/* d(a . grad)/d p[0..n) against out[0..n). live: some of them must not be zero. */
static void check_knobs(const char *name, double *p, const double *out, int n, double step,
                        int live) {
    double big = 0, worst = 0;
    int    i;
    for (i = 0; i < n; i++) big = fmax(big, fabs(out[i]));
    for (i = 0; i < n; i++) {
        double fd;
        knob = p + i;
        knob_start = p[i];
        fd = DIFFERENCE(turned, step);
        worst = fmax(worst, fabs(fd - out[i]));
    }
    if (!(worst <= 1e-6 * big + 1e-11) || (live && !(big > 0)))
        printf("  vjp by %s: %g of %g\n", name, worst, big);
    CHECK(worst <= 1e-6 * big + 1e-11);
    CHECK(!live || big > 0);
}

typedef struct pulls {
    double x_n[MOST], v_n[MOST], force[MOST], mass[MOST], gravity[3], wind[3], mu[2], lambda[2];
    double bending[2], damping[2], theta0[MOST], scale[MOST], X[MOST], attach[3 * 64], k[64], h;
} pulls;

static void pull(pulls *p) {
    cloth_vjp out;
    int       i;
    memset(p, 0, sizeof *p);
    out.x_n = p->x_n;
    out.v_n = p->v_n;
    out.force = p->force;
    out.mass = p->mass;
    out.gravity = p->gravity;
    out.wind = p->wind;
    out.mu = p->mu;
    out.lambda = p->lambda;
    out.bending = p->bending;
    out.damping = p->damping;
    out.theta0 = p->theta0;
    out.hinge_scale = p->scale;
    out.X = p->X;
    out.attach = p->attach;
    out.attach_k = p->k;
    out.h = &p->h;
    (void)pulled();                         /* lags, and leaves goal.e.x at X0 */
    goal.e.x = X0;
    for (i = 0; i < S.sim->nterms; i++)
        CHECK(S.sim->term[i].vjp(S.sim->term[i].user, &goal.e, A, &out) == CLOTH_OK);
    memset(&out, 0, sizeof out);            /* nothing wanted: nothing touched */
    for (i = 0; i < S.sim->nterms; i++)
        CHECK(S.sim->term[i].vjp(S.sim->term[i].user, &goal.e, A, &out) == CLOTH_OK);
}

static void check_all_knobs(int bend) {
    static pulls  p;
    cloth_sim    *s = S.sim;
    cloth_params *q = &s->params;
    const int     hinge = bend == CLOTH_BEND_HINGE, any = bend != CLOTH_BEND_NONE;
    const int     moves = H_STEP > 0;       /* at h = 0 nothing is damped */
    int           n = 3 * S.nv, r;
    pull(&p);
    check_knobs("x_n", s->state.x, p.x_n, n, 1e-4, 1);
    check_knobs("v_n", s->state.v, p.v_n, n, 1e-3, 1);
    check_knobs("force", s->force, p.force, n, 1e-3, 1);
    check_knobs("mass", q->mass, p.mass, S.nv, 1e-4, 1);
    check_knobs("gravity", s->gravity, p.gravity, 3, 1e-2, 1);
    check_knobs("wind", s->wind, p.wind, 3, 1e-3, 1);
    for (r = 0; r < 2; r++) {
        check_knobs("mu", &lame[r][0], &p.mu[r], 1, 1e-2, 1);
        check_knobs("lambda", &lame[r][1], &p.lambda[r], 1, 1e-2, 1);
        check_knobs("bending", &q->material[r].bending, &p.bending[r], 1, 1e-5, any);
        check_knobs("damping", &q->material[r].damping, &p.damping[r], 1, 1e-5, moves);
    }
    check_knobs("theta0", q->theta0, p.theta0, q->nh, 1e-3, hinge);
    check_knobs("hinge_scale", q->hinge_scale, p.scale, q->nh, 1e-3, any);
    check_knobs("X", q->X, p.X, 6 * q->nf, 1e-4, 1);
    check_knobs("attach", s->attach[0].target, p.attach, 3, 1e-3, 1);
    check_knobs("attach_k", &s->attach[0].k, p.k, 1, 1e-3, 1);
    if (moves) check_knobs("h", &H_STEP, &p.h, 1, 1e-5, 1);
    CHECK(moves || !(fabs(p.h) > 0));
}

static void vjps(void) {
    int m, b, i, r;
    FOR_RUNGS(m, b) {
        open_scene((cloth_membrane)m, (cloth_bend_model)b, WITH_ALL);
        for (i = 0; i < 3 * S.nv; i++) A[i] = noise(5000u + (unsigned)i);
        for (r = 0; r < 2; r++)
            cloth_material_lame(S.sim->params.material + r, &lame[r][0], &lame[r][1]);
        for (r = 0; r < 2; r++) {           /* in a substep; in statics and LEAPFROG */
            H_STEP = r ? 0 : 0.01;
            check_all_knobs(b);
        }
    }
}

/* --- damping --- */

/* x = R x_n + t: what damping adds to the gradient is nothing. */
static void damping_ignores_rigid_motion(void) {
    const double c = cos(0.7), s = sin(0.7);
    double       with[MOST], without[MOST], moved[MOST], big = 0, worst = 0;
    int          m, b, i;
    FOR_RUNGS(m, b) {
        if (b == CLOTH_BEND_QUADRATIC) continue;        /* translations only: see below */
        open_scene((cloth_membrane)m, (cloth_bend_model)b, WITH_NOISE | WITH_DAMPING);
        for (i = 0; i < S.nv; i++) {
            const double *x = S.sim->state.x + 3 * i;
            moved[3 * i] = c * x[0] - s * x[1] + 0.3;
            moved[3 * i + 1] = s * x[0] + c * x[1] - 0.2;
            moved[3 * i + 2] = x[2] + 1.0;
        }
        lag(0.01, 0);
        value_at(moved, with);
        lag(0, 0);
        value_at(moved, without);
        big = worst = 0;
        for (i = 0; i < 3 * S.nv; i++) {
            big = fmax(big, fabs(without[i]));
            worst = fmax(worst, fabs(with[i] - without[i]));
        }
        CHECK(worst <= 1e-11 * big);
    }
}

/* A damped sheet that falls freely, flat or not, falls like a stone. */
static void damped_fall_is_free(void) {
    int m, b, i, k;
    FOR_RUNGS(m, b) {
        double v[3] = {0.3, -0.1, 0.2}, fall = 0, worst = 0;
        scene_close(&S);
        scene_desc(&S, 4, NULL, WITH_DAMPING);
        S.desc.tolerance = 1e-13;
        S.desc.cg_tolerance = 1e-8;
        S.desc.membrane = (cloth_membrane)m;
        S.desc.bend = (cloth_bend_model)b;
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        for (i = 0; i < 3 * S.nv; i++) S.sim->state.v[i] = v[i % 3];
        for (k = 1; k <= 10; k++) {
            CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
            fall += 0.01 * (-9.81 * 0.01 * k);
        }
        for (i = 0; i < 3 * S.nv; i++)
            worst = fmax(worst, fabs(S.sim->state.x[i] - S.mesh->x[i] - 0.1 * v[i % 3] -
                                     (i % 3 == 1 ? fall : 0)));
        CHECK_NEAR(worst, 0, 1e-12);
    }
}

/* --- wind --- */

/* drag = lift: a face feels c |u| (w - v), v the velocity that the step gives it. */
static void wind_is_drag(void) {
    double g[MOST], want[MOST], big = 0, worst = 0;
    int    f, i, j, k;
    open_scene(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, WITH_NOISE | WITH_WIND);
    ((cloth_model *)(uintptr_t)S.model)->desc.lift = S.desc.drag;
    memset(want, 0, sizeof want);
    for (f = 0; f < S.desc.nf; f++) {
        const int    *v = S.desc.faces + 3 * f;
        const double *x = S.sim->state.x, *vel = S.sim->state.v;
        double a[3], b[3], n[3], area, speed = 0, u[3], now[3];
        for (k = 0; k < 3; k++) {
            a[k] = x[3 * v[1] + k] - x[3 * v[0] + k];
            b[k] = x[3 * v[2] + k] - x[3 * v[0] + k];
            u[k] = now[k] = 0;
            for (j = 0; j < 3; j++) {
                u[k] += vel[3 * v[j] + k] / 3;
                now[k] += (X0[3 * v[j] + k] - x[3 * v[j] + k]) / 0.01 / 3;
            }
            u[k] -= S.desc.wind[k];
            speed += u[k] * u[k];
        }
        n[0] = a[1] * b[2] - a[2] * b[1];
        n[1] = a[2] * b[0] - a[0] * b[2];
        n[2] = a[0] * b[1] - a[1] * b[0];
        area = 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (i = 0; i < 9; i++)
            want[3 * v[i / 3] + i % 3] += 0.5 * 1.2 * 1.0 * area * sqrt(speed) *
                                          (S.desc.wind[i % 3] - now[i % 3]) / 3;
    }
    lag(0.01, 0);
    memset(g, 0, sizeof g);
    goal.e.x = X0;
    goal.e.grad = g;
    goal.e.hess = NULL;
    CHECK(S.sim->term[CLOTHI_TERM_WIND].eval(&S.sim->own, &goal.e, along_x) == CLOTH_OK);
    for (i = 0; i < 3 * S.nv; i++) {
        big = fmax(big, fabs(want[i]));
        worst = fmax(worst, fabs(-g[i] - want[i]));
    }
    CHECK(big > 0);
    CHECK(worst <= 1e-12 * big);
}

/* The lightest cloth in a storm, h = 1 s. */
static void wind_is_stable(void) {
    int          k, i;
    cloth_report r;
    scene_close(&S);
    scene_desc(&S, 6, NULL, 0);
    S.desc.material.density = 0.01;
    S.desc.wind_on = 1;
    S.desc.wind[0] = 45.0;
    S.desc.wind[1] = 10.0;
    CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
    for (k = 0; k < 20; k++) {
        double fastest = 0;
        CHECK(cloth_step(S.sim, 1.0, &r) == CLOTH_OK);
        for (i = 0; i < 3 * S.nv; i++) fastest = fmax(fastest, fabs(S.sim->state.v[i]));
        CHECK(fastest < 50.0);
        CHECK(r.counts.wind_faces > 0);
    }
}

/* Statics in wind: ends where the elastic force balances the wind's at that place. */
static void wind_in_statics(void) {
    double       g[MOST], big = 0;
    cloth_report r;
    int          i;
    scene_close(&S);
    scene_desc(&S, 4, NULL, WITH_WIND);
    S.desc.tolerance = 1e-8;
    S.desc.lift = 0.5;
    S.desc.wind[0] = 0.5;
    S.desc.wind[1] = 2.0;
    CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
    CHECK(cloth_sim_pin(S.sim, 3, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
    CHECK(cloth_sim_pin(S.sim, S.nv - 1, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
    CHECK(cloth_solve_static(S.sim, &r) == CLOTH_OK && r.outcome == CLOTH_STEP_CONVERGED);
    CHECK(cloth_sim_potential(S.sim, S.sim->state.x, NULL, g) == CLOTH_OK);
    for (i = 0; i < 3 * S.nv; i++)
        if (!(S.sim->pin[i / 3] >> (i % 3) & 1)) big = fmax(big, fabs(g[i]));
    CHECK_NEAR(big, 0, 1e-6);
}

/* With the default lift the same sheet is a flag: no time step lets it come to rest, and statics
 * says that it found no equilibrium. With ten times the lift it rests after 10 s. */
static void flag_has_no_statics(void) {
    cloth_report r;
    int          calm, n, i;
    for (calm = 0; calm < 2; calm++) {
        double   fast = 0;
        uint64_t before;
        scene_close(&S);
        scene_desc(&S, 4, NULL, WITH_WIND);
        S.desc.lift = calm ? 0.5 : CLOTH_DEFAULT_LIFT;
        S.desc.wind[0] = 0.5;
        S.desc.wind[1] = 2.0;
        CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
        CHECK(cloth_sim_pin(S.sim, 3, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
        CHECK(cloth_sim_pin(S.sim, S.nv - 1, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
        before = cloth_sim_hash(S.sim);
        CHECK(cloth_solve_static(S.sim, &r) == (calm ? CLOTH_OK : CLOTH_ERR_STEP));
        CHECK(r.outcome == (calm ? CLOTH_STEP_CONVERGED : CLOTH_STEP_STALLED));
        CHECK((r.vertex >= 0) == !calm);    /* and the sentence names it */
        CHECK(calm || cloth_sim_hash(S.sim) == before);
        for (n = 0; n < 1800; n++) CHECK(cloth_step(S.sim, 1.0 / 60, NULL) == CLOTH_OK);
        for (n = 0; n < 120; n++) {
            CHECK(cloth_step(S.sim, 1.0 / 60, NULL) == CLOTH_OK);
            for (i = 0; i < 3 * S.nv; i++) fast = fmax(fast, fabs(S.sim->state.v[i]));
        }
        printf("  lift %.2f: %.1e m/s after 30 s\n", S.desc.lift, fast);
        CHECK(calm ? fast < 1e-4 : fast > 0.05);
    }
}

/* --- ties --- */

static void add_ties(cloth_tie *tie) {
    tie[0].leader = 2;                      /* along rows, one chain, one follower pinned */
    tie[0].follower = 3;
    tie[0].axes = CLOTH_AXIS_X | CLOTH_AXIS_Y;
    tie[1].leader = 3;
    tie[1].follower = 9;
    tie[1].axes = CLOTH_AXIS_Y;
    tie[2].leader = 5;
    tie[2].follower = 6;
    tie[2].axes = CLOTH_AXIS_ALL;
    S.desc.nties = 3;
    S.desc.ties = tie;
}

/* T' H T and T' g by dense products against the fold in place. */
static void ties_fold(void) {
    cloth_tie tie[3];
    double   *H, *K, *want, g[MOST], value, big = 0, worst = 0;
    int       n, i, j, a, b, root[MOST], m, bend;
    FOR_RUNGS(m, bend) {
        scene_close(&S);
        scene_desc(&S, 4, NULL, WITH_NOISE);
        S.desc.membrane = (cloth_membrane)m;
        S.desc.bend = (cloth_bend_model)bend;
        add_ties(tie);
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        n = 3 * S.nv;
        H = (double *)malloc((size_t)(3 * n * n) * sizeof(double));
        K = H + n * n;
        want = K + n * n;
        for (i = 0; i < n; i++) root[i] = i;
        for (i = 0; i < 3; i++)             /* in order: leaders of leaders are known */
            for (j = 0; j < 3; j++)
                if (tie[i].axes >> j & 1)
                    root[3 * tie[i].follower + j] = root[3 * tie[i].leader + j];
        lag(0.01, 0.01);
        CHECK(clothi_objective(S.sim, &goal, S.sim->state.x, g, 1, 0, &value) == CLOTH_OK);
        dense(H);
        clothi_tie_matrix(S.sim);
        dense(K);
        memset(want, 0, (size_t)(n * n) * sizeof(double));
        for (a = 0; a < n; a++)
            for (b = 0; b < n; b++) want[root[a] * n + root[b]] += H[a * n + b];
        big = worst = 0;
        for (i = 0; i < n * n; i++) {
            big = fmax(big, fabs(want[i]));
            worst = fmax(worst, fabs(want[i] - K[i]));
        }
        CHECK(worst <= 1e-13 * big);
        free(H);
    }
}

static void ties_hold(void) {
    static const double to[3] = {0.05, 0.02, 9.0};
    cloth_tie    tie[3];
    cloth_report r;
    double       off[3], dx;
    int          i, k, kind;
    for (kind = CLOTH_INTEGRATOR_EULER; kind <= (int)CLOTH_INTEGRATOR_BDF2; kind++) {
        scene_close(&S);
        scene_desc(&S, 4, NULL, WITH_NOISE);
        S.desc.integrator = (cloth_integrator)kind;
        S.desc.tolerance = 1e-10;
        add_ties(tie);
        CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
        for (i = 0; i < 3; i++)
            off[i] = S.start[3 * tie[i].follower + 1] - S.start[3 * tie[i].leader + 1];
        /* a pin on a follower holds the leader and all that follow it; unpinned likewise */
        CHECK(cloth_sim_pin(S.sim, 9, CLOTH_AXIS_Y, to) == CLOTH_OK);
        for (k = 0; k < 6; k++) {
            double *x = S.sim->state.x;
            CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_OK);
            CHECK_NEAR(r.residual_N, 0, 1e-6);
            for (i = 0; i < 3; i++)
                CHECK_NEAR(x[3 * tie[i].follower + 1] - x[3 * tie[i].leader + 1], off[i], 1e-15);
            if (k < 4) CHECK_NEAR(x[3 * 9 + 1], 0.02, 1e-15);
            if (k == 3) {
                CHECK(cloth_sim_unpin(S.sim, 9) == CLOTH_OK);
                for (i = 0; i < S.nv; i++) CHECK(i == 0 || i == S.nv - 1 || !S.sim->pin[i]);
            }
        }
        dx = fabs(S.sim->state.x[3 * 9 + 1] - 0.02);
        CHECK(dx > 1e-6);
    }
}

/* All pinned and lifted at one speed: the supports do the work of the weight, first of the impulse
 * too, as forces of followers are counted once, at their leader. */
static void ties_lifted(void) {
    const double h = 0.01, lift = 1e-3;
    cloth_tie    tie[3];
    cloth_report r;
    double       to[3], force;              /* N/kg                                            */
    int          i, k;
    scene_close(&S);
    scene_desc(&S, 4, NULL, WITH_NOISE);
    add_ties(tie);
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    for (k = 1; k <= 4; k++) {
        for (i = 0; i < S.nv; i++) {
            memcpy(to, S.start + 3 * i, sizeof to);
            to[1] += k * lift;
            CHECK(cloth_sim_pin(S.sim, i, CLOTH_AXIS_ALL, to) == CLOTH_OK);
        }
        CHECK(cloth_step(S.sim, h, &r) == CLOTH_OK);
        force = (k == 1 ? lift / (h * h) : 0) - S.sim->gravity[1];
        CHECK_REL(r.energy.pin_work, S.sim->total * force * lift, 1e-9);
    }
}

/* A pin that the desc has on a follower is its leader's, and holds all that follow it. */
static void ties_of_pinned(void) {
    cloth_tie tie[3];
    cloth_pin pin;
    int       i, k;
    scene_close(&S);
    scene_desc(&S, 4, NULL, WITH_NOISE);
    memset(&pin, 0, sizeof pin);
    pin.vertex = 9, pin.axes = CLOTH_AXIS_Y;
    S.desc.npins = 1, S.desc.pins = &pin;
    add_ties(tie);
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    CHECK(S.sim->pin[9] == 0 && S.sim->pin[2] == CLOTH_AXIS_Y);
    for (k = 0; k < 3; k++) CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    for (i = 0; i < 2; i++) {
        const int at = 3 * tie[i].follower + 1;
        CHECK_NEAR(S.sim->state.x[at], S.start[at], 1e-15);
    }
    CHECK(fabs(S.sim->state.x[3 * 8 + 1] - S.start[3 * 8 + 1]) > 1e-4);
}

/* --- pins --- */

typedef struct watch {
    int    vertex, count;
    double at[64][3];
} watch;

static cloth_status watch_begin(void *user, const cloth_eval *e) {
    watch *w = (watch *)user;
    if (e->h > 0 && w->count < 64)
        memcpy(w->at[w->count++], e->x_n + 3 * w->vertex, 3 * sizeof(double));
    return CLOTH_OK;
}

static cloth_status nothing(void *user, const cloth_eval *e, double *energy) {
    (void)user;
    (void)e;
    *energy = 0;
    return CLOTH_OK;
}

static void pins_reach_their_targets(void) {
    static const double to[3] = {0.25, 0.31, 0.4};
    int kind, k, j;
    FOR_INTEGRATORS(kind) {
        cloth_term term;
        watch      w;
        double     from[3];
        scene_close(&S);
        scene_desc(&S, 4, NULL, 0);
        S.desc.integrator = (cloth_integrator)kind;
        S.desc.substeps = kind == CLOTH_INTEGRATOR_LEAPFROG ? 0 : 5;
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        memset(&w, 0, sizeof w);
        memset(&term, 0, sizeof term);
        w.vertex = 7;
        term.name = "watch";
        term.user = &w;
        term.begin = watch_begin;
        term.eval = nothing;
        CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
        memcpy(from, S.sim->state.x + 21, sizeof from);
        CHECK(cloth_sim_pin(S.sim, 7, CLOTH_AXIS_ALL, to) == CLOTH_OK);
        CHECK(cloth_sim_pin(S.sim, 2, CLOTH_AXIS_Y, to) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.05, NULL) == CLOTH_OK);
        for (j = 0; j < 3; j++) CHECK(S.sim->state.x[21 + j] == to[j]);
        CHECK(S.sim->state.x[7] == to[1]);
        CHECK(fabs(S.sim->state.x[6] - S.mesh->x[6]) > 1e-9);
        for (k = 0; kind != CLOTH_INTEGRATOR_LEAPFROG && k < 5; k++)
            for (j = 0; j < 3; j++)
                CHECK_NEAR(w.at[k][j], from[j] + k / 5.0 * (to[j] - from[j]), 1e-15);
        CHECK(kind == CLOTH_INTEGRATOR_LEAPFROG || w.count == 5);
        CHECK(cloth_step(S.sim, 0.05, NULL) == CLOTH_OK);       /* and stay there */
        for (j = 0; j < 3; j++) CHECK(S.sim->state.x[21 + j] == to[j]);
    }
}

/* --- a host's term: a spring between vertices that no element couples --- */

typedef struct rope {
    int      a, b;
    double   k;
    double   used;                          /* a state of its own, changed in begin            */
} rope;

static cloth_status rope_begin(void *user, const cloth_eval *e) {
    rope *r = (rope *)user;
    if (e->h > 0) r->used += e->h;
    return CLOTH_OK;
}

static cloth_status rope_eval(void *user, const cloth_eval *e, double *energy) {
    const rope *r = (const rope *)user;
    const int   v[2] = {r->a, r->b};
    double      H[36] = {0}, k = r->k * (1 + r->used);
    int         i;
    *energy = 0;
    for (i = 0; i < 3; i++) {
        double d = e->x[3 * r->a + i] - e->x[3 * r->b + i];
        *energy += 0.5 * k * d * d;
        if (e->grad) e->grad[3 * r->a + i] += k * d;
        if (e->grad) e->grad[3 * r->b + i] -= k * d;
        H[6 * i + i] = H[6 * (i + 3) + i + 3] = k;
        H[6 * i + i + 3] = H[6 * (i + 3) + i] = -k;
    }
    return e->hess ? cloth_matrix_add_element(e->hess, 2, v, H) : CLOTH_OK;
}

static size_t rope_size(void *user) {
    (void)user;
    return sizeof(double);
}
static void rope_save(void *user, void *buf) { memcpy(buf, &((rope *)user)->used, 8); }
static void rope_load(void *user, const void *buf) { memcpy(&((rope *)user)->used, buf, 8); }

static void host_term(void) {
    static unsigned char saved[1 << 17];
    cloth_term   term;
    cloth_report r;
    rope         line;
    double       gap0, gap1;
    uint64_t     hash;
    int          k;
    scene_close(&S);
    scene_desc(&S, 5, NULL, 0);
    S.desc.tolerance = 1e-9;
    S.desc.cg_tolerance = 1e-4;
    S.desc.integrator = CLOTH_INTEGRATOR_BDF2;
    CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
    memset(&term, 0, sizeof term);
    memset(&line, 0, sizeof line);
    line.a = 0;
    line.b = S.nv - 3;
    line.k = 300.0;
    term.name = "rope";
    term.user = &line;
    term.begin = rope_begin;
    term.eval = rope_eval;
    CHECK(cloth_sim_add_term(NULL, &term) == CLOTH_ERR_ARGUMENT);
    term.save = rope_save;
    CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_ERR_ARGUMENT);
    term.save_size = rope_size;
    term.load = rope_load;
    CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
    gap0 = fabs(S.sim->state.x[0] - S.sim->state.x[3 * line.b]);
    for (k = 0; k < 5; k++) {
        CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_OK && r.outcome == CLOTH_STEP_CONVERGED);
        CHECK_NEAR(r.residual_N, 0, 1e-6);
        if (k > 1 && !r.restarts)           /* its Hessian is in the matrix; without it it stalls */
            CHECK(r.newton <= 20);
        CHECK(r.energy.other > 0);
    }
    gap1 = fabs(S.sim->state.x[0] - S.sim->state.x[3 * line.b]);
    CHECK(gap1 < gap0);
    CHECK_NEAR(line.used, 0.05, 1e-12);
    /* its state is part of the hash and of the snapshot */
    hash = cloth_sim_hash(S.sim);
    line.used += 1;
    CHECK(cloth_sim_hash(S.sim) != hash);
    line.used -= 1;
    line.used = 0.05;
    hash = cloth_sim_hash(S.sim);
    CHECK(cloth_sim_save_size(S.sim) <= sizeof saved);
    CHECK(cloth_sim_save(S.sim, saved, sizeof saved) == CLOTH_OK);
    for (k = 0; k < 3; k++) CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    CHECK(cloth_sim_hash(S.sim) != hash && line.used > 0.06);
    CHECK(cloth_sim_restore(S.sim, saved, sizeof saved) == CLOTH_OK);
    CHECK(cloth_sim_hash(S.sim) == hash && line.used == 0.05);
    /* the number of a sim's terms is bounded, and says so */
    term.save_size = NULL;
    term.save = NULL;
    term.load = NULL;
    term.eval = nothing;
    for (k = 0; cloth_sim_add_term(S.sim, &term) == CLOTH_OK; k++) {}
    CHECK(k >= 8 && cloth_sim_add_term(S.sim, &term) == CLOTH_ERR_CAPACITY);
}

/* What each of a host's terms holds is in the ledger. */
static cloth_status held_eval(void *user, const cloth_eval *e, double *energy) {
    (void)e;
    *energy = *(const double *)user;
    return CLOTH_OK;
}

/* A spring that pulls vertex 12 up to a ledge of 1 kJ, and from there on by `left` m more, of which
 * its energy knows nothing: no step leads up there. */
typedef struct ledge {
    double at, left;                        /* m */
} ledge;

static cloth_status ledge_eval(void *user, const cloth_eval *e, double *energy) {
    const ledge *l = (const ledge *)user;
    const double k = 1e8, off = e->x[37] - l->at;
    const double H[9] = {0, 0, 0, 0, 1e8, 0, 0, 0, 0};
    const int    v = 12;
    *energy = 0.5 * k * off * off + (off > 1e-9 ? 1e3 : 0);
    if (e->grad) e->grad[37] += k * (off - (off > -1e-9 ? l->left : 0));
    return e->hess ? cloth_matrix_add_element(e->hess, 1, &v, H) : CLOTH_OK;
}

/* What is left below the tolerance has arrived; more is a step that does not end, in steps as in
 * statics, by the definite Hessian (at the ledge) and by the exact one (before it). */
static void ledges(void) {
    static const struct { double left, before; } way[3] = {{0.5e-6, 0}, {3e-4, 0}, {3e-4, 7e-4}};
    int k;
    for (k = 0; k < 3; k++) {
        cloth_term   term;
        cloth_report r;
        ledge        l;
        uint64_t     hash;
        scene_close(&S);
        scene_desc(&S, 4, NULL, 0);
        S.desc.gravity[1] = 0, S.desc.tolerance = 1e-6, S.desc.cg_tolerance = 1e-6;
        CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
        memset(&term, 0, sizeof term);
        term.user = &l, term.eval = ledge_eval;
        l.at = S.sim->state.x[37] + way[k].before, l.left = way[k].left;
        CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
        hash = cloth_sim_hash(S.sim);
        if (k == 0) {
            CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_OK && r.outcome == CLOTH_STEP_CONVERGED);
            CHECK(r.residual_m > 1e-7 && r.residual_m < 1e-6);
        } else {
            CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_ERR_STEP && cloth_sim_hash(S.sim) == hash);
            CHECK(cloth_solve_static(S.sim, &r) == CLOTH_ERR_STEP);
            CHECK(cloth_sim_hash(S.sim) == hash);
        }
    }
}

static void two_host_terms(void) {
    double       held[2] = {0.25, 0.5};
    cloth_ledger l;
    cloth_term   term;
    int          k;
    scene_close(&S);
    scene_desc(&S, 4, NULL, 0);
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    memset(&term, 0, sizeof term);
    term.name = "held", term.eval = held_eval;
    for (k = 0; k < 2; k++) {
        term.user = held + k;
        CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
    }
    CHECK(cloth_sim_energy(S.sim, &l) == CLOTH_OK);
    CHECK_NEAR(l.other, 0.75, 0);
}

/* What cloth_eval's comment promises a host's term, under each integrator. */
typedef struct witness {
    cloth_integrator kind;
    const double    *x, *v;                 /* the state's                                     */
    double           h, t, first;           /* of a substep, s; the step's start               */
    int              statics, begun, asked, bad;
} witness;

static int witness_sees(witness *w, const cloth_eval *e) {
    const int leap = w->kind == CLOTH_INTEGRATOR_LEAPFROG, still = w->statics;
    int       bad = 0;
    bad += fabs(e->h - (still || leap ? 0 : w->h)) > 1e-15;
    if (leap) bad += e->x_n != e->x || e->hess != NULL;
    else bad += e->x_n != w->x || e->v_n != w->v;
    if (still) bad += fabs(e->t - w->t) > 1e-12;
    else if (leap) bad += fabs(e->t - (w->first + w->h * w->asked)) > 1e-12;
    return bad;
}

static cloth_status witness_begin(void *user, const cloth_eval *e) {
    witness *w = (witness *)user;
    w->begun++;
    w->t = e->t;
    if (w->kind == CLOTH_INTEGRATOR_LEAPFROG && !w->statics) w->bad += e->x_n != e->x;
    else w->bad += e->x_n != w->x || e->v_n != w->v;
    return CLOTH_OK;
}

static cloth_status witness_eval(void *user, const cloth_eval *e, double *energy) {
    witness *w = (witness *)user;
    double   half = w->asked ? 0.5 * w->h : 0;
    *energy = 0;
    if (w->kind == CLOTH_INTEGRATOR_BDF2 && !w->statics && !(e->h > 0))     /* for its watch */
        return CLOTH_OK;
    w->bad += witness_sees(w, e);
    if (w->kind == CLOTH_INTEGRATOR_LEAPFROG && !w->statics)    /* it falls: v lags by a half */
        w->bad += fabs(e->v_n[1] + 9.81 * (w->h * w->asked - half)) > 1e-9;
    w->asked++;
    return CLOTH_OK;
}

static void what_a_term_sees(void) {
    int kind, k;
    FOR_INTEGRATORS(kind) {
        cloth_term   term;
        witness      w;
        cloth_ledger l;
        scene_close(&S);
        scene_desc(&S, 4, NULL, 0);
        S.desc.integrator = (cloth_integrator)kind;
        S.desc.substeps = kind == CLOTH_INTEGRATOR_LEAPFROG ? 40 : 2;
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        memset(&w, 0, sizeof w);
        memset(&term, 0, sizeof term);
        w.kind = (cloth_integrator)kind;
        w.x = S.sim->state.x, w.v = S.sim->state.v;
        w.h = 0.01 / S.desc.substeps;
        term.name = "witness", term.user = &w;
        term.begin = witness_begin, term.eval = witness_eval;
        CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
        for (k = 0; k < (kind == CLOTH_INTEGRATOR_LEAPFROG ? 1 : 3); k++) {
            w.first = S.sim->state.t;
            w.begun = w.asked = 0;
            CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
            CHECK(w.begun >= S.desc.substeps && w.asked > S.desc.substeps);
            CHECK_NEAR(w.t, S.sim->state.t, 1e-12);
        }
        w.statics = 1;                      /* energies: at the state */
        w.asked = 0;
        CHECK(cloth_sim_energy(S.sim, &l) == CLOTH_OK && w.asked > 0);
        CHECK_NEAR(w.t, S.sim->state.t, 1e-12);
        CHECK(w.bad == 0);
    }
}

/* --- places where meshes go wrong --- */

/* A vertex of no triangle falls freely and disturbs nobody. */
static void isolated_vertex(void) {
    static const double X[15] = {0, 0, 0, 0.1, 0, 0, 0, 0, -0.1, 5, 5, 5, 0.1, 0, -0.1};
    static const int    F[6] = {0, 1, 2, 1, 4, 2};
    int                 kind, k;
    FOR_INTEGRATORS(kind) {
        double fall = 0, t = 0;
        scene_close(&S);
        scene_desc(&S, 3, NULL, 0);
        S.desc.nv = S.nv = 5;
        S.desc.nf = 2;
        S.desc.x_rest = X;
        S.desc.tolerance = 1e-13;
        S.desc.cg_tolerance = 1e-8;
        S.desc.faces = F;
        S.desc.integrator = (cloth_integrator)kind;
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        for (k = 1; k <= 10; k++) {
            CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
            t += 0.01;
            fall += 0.01 * 9.81 * 0.01 * k;
        }
        if (kind == CLOTH_INTEGRATOR_EULER) CHECK_NEAR(S.sim->state.x[10], 5 - fall, 1e-12);
        if (kind == CLOTH_INTEGRATOR_LEAPFROG)
            CHECK_NEAR(S.sim->state.x[10], 5 - 0.5 * 9.81 * t * t, 1e-12);
        CHECK_NEAR(S.sim->state.x[10] - 5, S.sim->state.x[1], 1e-12);
    }
}

/* The same motion a hundred kilometres away, to what is left of a double there. */
static void far_from_origin(void) {
    double *near_x;
    int     kind, i, k;
    FOR_INTEGRATORS(kind) {
        double worst = 0;
        scene_close(&S);
        scene_desc(&S, 5, NULL, WITH_NOISE | WITH_DAMPING | WITH_WIND);
        S.desc.integrator = (cloth_integrator)kind;
        CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
        near_x = (double *)malloc(3 * (size_t)S.nv * sizeof(double));
        for (k = 0; k < 8; k++) CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
        memcpy(near_x, S.sim->state.x, 3 * (size_t)S.nv * sizeof(double));
        scene_close(&S);
        scene_desc(&S, 5, NULL, WITH_NOISE | WITH_DAMPING | WITH_WIND);
        S.desc.integrator = (cloth_integrator)kind;
        for (i = 0; i < 3 * S.nv; i++) S.start[i] += 1e5;
        CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
        for (k = 0; k < 8; k++) CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
        for (i = 0; i < 3 * S.nv; i++)
            worst = fmax(worst, fabs(S.sim->state.x[i] - 1e5 - near_x[i]));
        if (!(worst < 2e-6)) printf("  %s: %g m\n", integrator_name(kind), worst);
        CHECK(worst < 2e-6);
        free(near_x);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(gradients_and_hessians);
    RUN(potential_is_consistent);
    RUN(vjps);
    RUN(damping_ignores_rigid_motion);
    RUN(damped_fall_is_free);
    RUN(wind_is_drag);
    RUN(wind_is_stable);
    RUN(wind_in_statics);
    RUN(flag_has_no_statics);
    RUN(ties_fold);
    RUN(ties_hold);
    RUN(ties_lifted);
    RUN(ties_of_pinned);
    RUN(pins_reach_their_targets);
    RUN(host_term);
    RUN(ledges);
    RUN(two_host_terms);
    RUN(what_a_term_sees);
    RUN(isolated_vertex);
    RUN(far_from_origin);
    scene_close(&S);
    return TEST_END();
}
