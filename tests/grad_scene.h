/* grad_scene.h - what the tests of gradients share: a scripted run of 22 steps in which everything
 * moves (a pin, an attachment, forces, wind, gravity, the material), a loss on all of it, and
 * directions in which each cause is moved. Differences are taken here by the public calls alone.
 * Include behind clothsim_grad.h, test.h and scene.h. */
#ifndef CLOTH_GRAD_SCENE_H
#define CLOTH_GRAD_SCENE_H

#define GRAD_STEPS 22
#define GRAD_ATTACH 4                       /* desc.max_attachments                            */

enum { BY_X0, BY_V0, BY_DENSITY, BY_MEMBRANE, BY_POISSON, BY_BENDING, BY_DAMPING, BY_X, BY_THETA0,
       BY_MASS, BY_GRAVITY, BY_WIND, BY_FORCE, BY_PIN, BY_SCALE, BY_ATTACH, BY_ATTACH_K, BY_COUNT };

static const char *const by_name[BY_COUNT] = {
    "x0", "v0", "density", "membrane", "poisson", "bending", "damping", "X", "theta0", "mass",
    "gravity", "wind", "force", "pin", "hinge_scale", "attach", "attach_k"};

typedef struct play {                       /* one scripted run                                */
    int    n, steps, with;                  /* vertices along a side, steps, WITH_...          */
    cloth_membrane   membrane;
    cloth_bend_model bend;
    cloth_integrator integrator;
    int    substeps, given, ties, still;    /* given: masses; still: nothing changes in time   */
    double calm;                            /* of the wind, 1                                  */
    double wobble;                          /* m, of the first pin, up and down from step 10 on */
    int   *again;                           /* NULL, or counts substeps taken as implicit Euler */
    double h, tolerance, step;              /* step: of differences                            */
    size_t bytes;                           /* of the tape; 0                                  */
    int    by;                              /* what is moved, by eps times its direction       */
    double eps;
    unsigned seed;
    const cloth_hooks *hooks;
} play;

static inline play play_default(void) {
    play p;
    memset(&p, 0, sizeof p);
    p.n = 5;
    p.steps = GRAD_STEPS;
    p.with = WITH_ALL;
    p.membrane = CLOTH_MEMBRANE_STVK;
    p.bend = CLOTH_BEND_HINGE;
    p.integrator = CLOTH_INTEGRATOR_EULER;
    p.h = 0.01;
    p.tolerance = 1e-12;
    p.step = 0.05;
    p.calm = 1;
    p.by = -1;
    p.seed = 1;
    return p;
}

/* Number i of the direction in which cause `by` is moved, in its unit. */
static inline double dir(const play *p, int by, int i) {
    static const double size[BY_COUNT] = {1e-3, 1e-2, 1e-2, 2, 1e-2, 1e-6, 1e-4, 1e-3, 1e-2, 1e-4,
                                          1e-1, 1e-1, 1e-3, 1e-3, 1e-2, 1e-3, 0.1};
    return size[by] * noise(100000u * p->seed + 5000u * (unsigned)by + (unsigned)i);
}

static inline double moved(const play *p, int by, int i) {
    return p->by == by ? p->eps * dir(p, by, i) : 0;
}

/* --- the loss: weights of x and v at every step, and a square --- */

typedef struct loss_user {
    double value;
    int    nv, steps, calls, only;          /* only: k that counts; -1: all                    */
} loss_user;

static inline void loss_at(int k, const double *x, const double *v, double *gx, double *gv,
                           void *user) {
    loss_user *u = (loss_user *)user;
    int        i;
    u->calls++;
    if (u->only >= 0 && k != u->only) return;
    for (i = 0; i < 3 * u->nv; i++) {
        const double a = noise(900000u + (unsigned)(k * 3 * u->nv + i));
        const double b = 0.03 * noise(1900000u + (unsigned)(k * 3 * u->nv + i)), c = x[i] - 0.2;
        u->value += a * x[i] + b * v[i] + 0.5 * c * c;
        if (gx) gx[i] += a + c;
        if (gv) gv[i] += b;
    }
}

/* --- the run --- */

static inline void play_desc(const play *p, scene *s) {
    static cloth_tie tie[2];
    scene_desc(s, p->n, p->hooks, p->with);
    s->desc.membrane = p->membrane;
    s->desc.bend = p->bend;
    s->desc.integrator = p->integrator;
    s->desc.substeps = p->substeps;
    s->desc.tolerance = p->tolerance;
    s->desc.cg_tolerance = 1e-4;
    s->desc.max_attachments = GRAD_ATTACH;
    s->desc.air_density = 1.2;
    s->desc.lift = p->calm < 1 ? 1 : 0.3;
    s->desc.material.membrane = 200 + moved(p, BY_MEMBRANE, 0);
    s->desc.material.poisson = 0.3 + moved(p, BY_POISSON, 0);
    s->desc.material.bending = 1e-4 + moved(p, BY_BENDING, 0);
    s->desc.material.density += moved(p, BY_DENSITY, 0);
    if (p->with & WITH_DAMPING) s->desc.material.damping += moved(p, BY_DAMPING, 0);
    if (p->ties) {
        tie[0].leader = 2, tie[0].follower = 7, tie[0].axes = CLOTH_AXIS_ALL;
        tie[1].leader = 0, tie[1].follower = 1, tie[1].axes = CLOTH_AXIS_Y;
        s->desc.nties = 2;
        s->desc.ties = tie;
    }
}

/* What fits write: masses, rest corners, rest angles, hinges. */
static inline void play_params(const play *p, scene *s) {
    cloth_params *q = cloth_sim_params(s->sim);
    int           i;
    q->mass_given = p->given;
    for (i = 0; i < s->nv && p->given; i++)
        q->mass[i] = 2e-3 * (1 + 0.2 * noise(77u + (unsigned)i)) + moved(p, BY_MASS, i);
    for (i = 0; i < 6 * q->nf; i++) q->X[i] += moved(p, BY_X, i);
    for (i = 0; i < q->nh; i++) {
        if (p->bend == CLOTH_BEND_HINGE) q->theta0[i] += moved(p, BY_THETA0, i);
        q->hinge_scale[i] += moved(p, BY_SCALE, i);
    }
    CHECK(cloth_sim_params_changed(s->sim) == CLOTH_OK);
}

/* What the host says before step k. */
static inline void play_say(const play *p, scene *s, cloth_attachment *extra, int k) {
    static double f[3 * 400];
    const int     still = p->still;
    double        to[3], g[3] = {0.3, -9.81, 0.1}, w[3] = {3, 1, -2};
    int           i, n = 3 * s->nv;
    for (i = 0; i < 3; i++) {
        g[i] += moved(p, BY_GRAVITY, i) + (still ? 0 : 0.02 * k);
        w[i] = p->calm * w[i] + moved(p, BY_WIND, i) + (still ? 0 : 0.05 * k * (i - 1));
    }
    CHECK(cloth_sim_set_gravity(s->sim, g) == CLOTH_OK);
    if (p->with & WITH_WIND) CHECK(cloth_sim_set_wind(s->sim, w) == CLOTH_OK);
    for (i = 0; i < n && i < 1200; i++)
        f[i] = 1e-3 * noise((unsigned)(7000 + i + (still ? 0 : n * k))) +
               moved(p, BY_FORCE, n * k + i);
    if (p->with & WITH_FORCE) CHECK(cloth_sim_set_force(s->sim, f) == CLOTH_OK);
    for (i = 0; i < 3; i++)
        to[i] = s->mesh->x[i] + (still ? 0 : 2e-3 * k * (i + 1)) + moved(p, BY_PIN, n * k + i);
    if (k >= 10) to[1] += k % 2 ? p->wobble : -p->wobble;
    if (p->with & WITH_PINS) CHECK(cloth_sim_pin(s->sim, 0, CLOTH_AXIS_ALL, to) == CLOTH_OK);
    if (p->with & WITH_PINS) {
        for (i = 0; i < 3; i++) to[i] = s->mesh->x[n - 3 + i] + moved(p, BY_PIN, n * k + n - 3 + i);
        CHECK(cloth_sim_pin(s->sim, s->nv - 1, 3, to) == CLOTH_OK);
    }
    if (!(p->with & WITH_ATTACH)) return;
    for (i = 0; i < 3; i++)
        to[i] = 0.1 + (still ? 0 : 0.004 * k) + moved(p, BY_ATTACH, 3 * GRAD_ATTACH * k + i);
    if (k == 0 || !still) CHECK(cloth_sim_attach_move(s->sim, s->attachment, to) == CLOTH_OK);
    if (k == 5) {                           /* one more, that closes over a step */
        static const double third[3] = {0.3, 0.3, 0.4};
        for (i = 0; i < 3; i++) to[i] = 0.2 + moved(p, BY_ATTACH, 3 * GRAD_ATTACH * k + 3 + i);
        CHECK(cloth_sim_attach(s->sim, 3, third, 3.0 + moved(p, BY_ATTACH_K, 1), to, extra) ==
              CLOTH_OK);
    } else if (k > 5) {
        for (i = 0; i < 3; i++) to[i] = 0.2 + moved(p, BY_ATTACH, 3 * GRAD_ATTACH * k + 3 + i);
        CHECK(cloth_sim_attach_move(s->sim, *extra, to) == CLOTH_OK);
    }
}

/* From step 9 on another material, in the middle of the run. */
static inline void play_change(const play *p, scene *s, int k) {
    cloth_material m = s->desc.material;
    if (p->still || k != 9) return;
    m.membrane += 30;
    m.bending += 2e-5;
    CHECK(cloth_sim_set_material(s->sim, 0, &m) == CLOTH_OK);
}

/* Model and sim at the start; v0 is written. */
static inline void play_open(const play *p, scene *s) {
    static const double third[3] = {0.25, 0.35, 0.4}, up[3] = {0.1, 0.1, 0.1};
    cloth_state *state;
    int          i;
    play_desc(p, s);
    CHECK(scene_open(s, p->with & ~WITH_ATTACH) == CLOTH_OK);
    state = cloth_sim_state(s->sim);
    if (p->with & WITH_ATTACH)              /* its pose stays where x0 moves */
        CHECK(cloth_sim_attach(s->sim, s->mesh->nf / 2, third, 5.0 + moved(p, BY_ATTACH_K, 0), up,
                               &s->attachment) == CLOTH_OK);
    for (i = 0; i < 3 * s->nv; i++) state->x[i] += moved(p, BY_X0, i);
    play_params(p, s);
    for (i = 0; i < 3 * s->nv; i++)
        state->v[i] = 0.1 * noise(333u + (unsigned)i) + moved(p, BY_V0, i);
    cloth_sim_state_changed(s->sim);
}

/* The loss of a run; tape: NULL, or made at its start. */
static inline double play_run(const play *p, scene *s, cloth_tape **tape, int only) {
    cloth_attachment extra;
    loss_user        u;
    int              k;
    memset(&u, 0, sizeof u);
    extra.id = 0;
    play_open(p, s);
    u.nv = s->nv;
    u.only = only;
    if (tape) {
        cloth_tape_options o = cloth_tape_options_default();
        o.bytes = p->bytes;
        CHECK(cloth_tape_create(s->sim, &o, tape) == CLOTH_OK);
    }
    loss_at(0, cloth_sim_state(s->sim)->x, cloth_sim_state(s->sim)->v, NULL, NULL, &u);
    for (k = 0; k < p->steps; k++) {
        cloth_report r;
        play_say(p, s, &extra, k);
        play_change(p, s, k);
        CHECK(cloth_step(s->sim, p->h, p->again ? &r : NULL) == CLOTH_OK);
        if (p->again) *p->again += r.restarts;
        loss_at(k + 1, cloth_sim_state(s->sim)->x, cloth_sim_state(s->sim)->v, NULL, NULL, &u);
    }
    return u.value;
}

static inline double play_value(play p, int by, double eps, int only) {
    scene  s;
    double value;
    p.by = by;
    p.eps = eps;
    value = play_run(&p, &s, NULL, only);
    scene_close(&s);
    return value;
}

#define GRAD_LEVELS 6

/* Derivative along the direction of `by`: central differences at eps, eps/4, eps/16, .., their
 * extrapolations (Richardson), and of all those the one that differs least from the two it is made
 * of (Ridders): at large steps the run takes other choices, at small ones rounding speaks. Digits
 * that agree are not asked again: nine in the long tier, else eight. */
static inline double play_difference(const play *p, int by, double eps, int only) {
    const double agree = test_full() ? 1e-9 : 1e-8;
    double       d[GRAD_LEVELS][GRAD_LEVELS], best = 0, error = HUGE_VAL;
    int          i, j;
    for (i = 0; i < GRAD_LEVELS && !(error < agree * fabs(best)); i++, eps *= 0.25) {
        double power = 16;
        d[i][0] = (play_value(*p, by, eps, only) - play_value(*p, by, -eps, only)) / (2 * eps);
        for (j = 1; j <= i; j++, power *= 16) {
            double off;
            d[i][j] = (power * d[i][j - 1] - d[i - 1][j - 1]) / (power - 1);
            off = fmax(fabs(d[i][j] - d[i][j - 1]), fabs(d[i][j] - d[i - 1][j - 1]));
            if (off < error) error = off, best = d[i][j];
        }
    }
    return best;
}

/* --- arrays for results --- */

typedef struct results {
    cloth_grad g;
    double    *array[BY_COUNT];
    int        n[BY_COUNT];
} results;

static inline results results_make(const scene *s, int steps) {
    const cloth_params *p = cloth_sim_params(s->sim);
    const int n = 3 * s->nv;
    results   r;
    int       by;
    const int count[BY_COUNT] = {n, n, 1, 1, 1, 1, 1, 6 * p->nf, p->nh, s->nv, 3, 3, steps * n,
                                 steps * n, p->nh, steps * 3 * GRAD_ATTACH, GRAD_ATTACH};
    double  **at[BY_COUNT];
    memset(&r, 0, sizeof r);
    at[BY_X0] = &r.g.x0, at[BY_V0] = &r.g.v0, at[BY_DENSITY] = &r.g.density;
    at[BY_MEMBRANE] = &r.g.membrane, at[BY_POISSON] = &r.g.poisson, at[BY_BENDING] = &r.g.bending;
    at[BY_DAMPING] = &r.g.damping, at[BY_X] = &r.g.X, at[BY_THETA0] = &r.g.theta0;
    at[BY_MASS] = &r.g.mass, at[BY_GRAVITY] = &r.g.gravity, at[BY_WIND] = &r.g.wind;
    at[BY_FORCE] = &r.g.force, at[BY_PIN] = &r.g.pin, at[BY_SCALE] = &r.g.hinge_scale;
    at[BY_ATTACH] = &r.g.attach, at[BY_ATTACH_K] = &r.g.attach_k;
    for (by = 0; by < BY_COUNT; by++) {
        r.n[by] = count[by];
        r.array[by] = *at[by] = (double *)malloc((size_t)(count[by] + 1) * sizeof(double));
        if (!r.array[by]) exit(2);
    }
    return r;
}

/* The gradient of loss_at into r. */
static inline void backward(cloth_tape *tape, const scene *s, results *r, cloth_grad_report *rep) {
    loss_user u;
    memset(&u, 0, sizeof u);
    u.nv = s->nv;
    u.only = -1;
    CHECK(cloth_grad_backward(tape, loss_at, &u, &r->g, rep) == CLOTH_OK);
}

static inline void results_free(results *r) {
    int by;
    for (by = 0; by < BY_COUNT; by++) free(r->array[by]);
}

/* The gradient along the direction of `by`. */
static inline double results_along(const results *r, const play *p, int by) {
    double sum = 0;
    int    i;
    for (i = 0; i < r->n[by]; i++) sum += r->array[by][i] * dir(p, by, i);
    return sum;
}

#endif
