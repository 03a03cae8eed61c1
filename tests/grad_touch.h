/* grad_touch.h - scenes of cloth in contact, by number, for derivatives: a small sheet that falls
 * or is thrown on a body of some kind, which moves; or on itself. What is moved by a cause, the
 * loss and its differences. Include behind clothsim_grad.h, clothsim_collide.h, test.h. */
#ifndef CLOTH_GRAD_TOUCH_H
#define CLOTH_GRAD_TOUCH_H

enum { TOUCH_X0, TOUCH_V0, TOUCH_MEMBRANE, TOUCH_BENDING, TOUCH_GRAVITY, TOUCH_FRICTION,
       TOUCH_OBSTACLE, TOUCH_CAUSES, TOUCH_START, TOUCH_REST };   /* the first two; others */
enum { TOUCH_PLANE, TOUCH_SPHERE, TOUCH_BOX, TOUCH_CAPSULE, TOUCH_MESH, TOUCH_SELF, TOUCH_BODIES };

static const char *const touch_cause[] = {"x0", "v0", "membrane", "bending", "gravity", "friction",
                                          "obstacle", "", "start", "rest"};
static const char *const touch_body[TOUCH_BODIES] = {"plane", "sphere", "box", "capsule", "mesh",
                                                     "self"};

typedef struct touch {                      /* one run                                         */
    int    body, n, steps, pins, bdf2, substeps, parts;
    size_t bytes;                           /* of the tape                                     */
    const cloth_hooks *hooks;
    int    cap, blind, leapfrog;            /* max_newton; blind: no estimate of early stops   */
    double spin;                            /* rad/s, of the body's surface                    */
    double friction, h, tilt, fall, tolerance, speed;
    int    by;                              /* cause that is moved, by eps times its direction */
    double eps;
    unsigned seed;
    cloth_mesh     *mesh;
    cloth_model    *model;
    cloth_sim      *sim;
    cloth_collide  *c;
    cloth_obstacle  id;
    double body_x[3 * 162];                 /* m, as it was added                              */
    int    body_nv, failed, inexact, contacts, rows;
} touch;

static inline double touch_noise(unsigned i) {
    i = i * 747796405u + 2891336453u;
    i = ((i >> ((i >> 28) + 4)) ^ i) * 277803737u;
    i = (i >> 22) ^ i;
    return (double)(i >> 8) / 8388608.0 - 1;
}

/* Number i of the direction of a cause, in its unit. */
static inline double touch_dir(const touch *t, int by, int i) {
    static const double size[TOUCH_CAUSES] = {1e-3, 1e-2, 2, 1e-6, 1e-1, 1e-2, 1e-3};
    return size[by] * touch_noise(977u * t->seed + 5003u * (unsigned)by + 131u * (unsigned)i);
}

static inline double touch_moved(const touch *t, int by, int i) {
    const int moves = t->by == by || (by < TOUCH_MEMBRANE ? t->by == TOUCH_START
                                                          : t->by == TOUCH_REST);
    return moves ? t->eps * touch_dir(t, by, i) : 0;
}

/* Scene number `seed`. */
static inline touch touch_make(unsigned seed) {
    touch t;
    memset(&t, 0, sizeof t);
    t.seed = seed;
    t.body = (int)(seed % TOUCH_BODIES);
    t.n = 5 + (int)(seed / TOUCH_BODIES % 3);
    t.steps = 20;
    t.pins = touch_noise(seed + 11) > 0.3;
    t.bdf2 = touch_noise(seed + 12) > 0;
    t.substeps = touch_noise(seed + 13) > 0.5 ? 2 : 1;
    t.friction = 0.25 + 0.25 * touch_noise(seed + 14);
    t.h = 0.01;
    t.tilt = 0.3 * touch_noise(seed + 15);
    t.fall = 0.3 + 0.3 * touch_noise(seed + 16);
    t.speed = 0.2 * touch_noise(seed + 17);
    t.tolerance = 1e-12;
    t.by = -1;
    return t;
}

static inline void touch_close(touch *t) {
    cloth_collide_destroy(t->c);
    cloth_sim_destroy(t->sim);
    cloth_model_destroy(t->model);
    cloth_mesh_destroy(NULL, t->mesh);
}

/* A sheet of 0.3 m in the plane y = 0.01, tilted; of the self-contact two sheets, the second below,
 * smaller and pinned. */
static inline void touch_sheet(touch *t) {
    cloth_mesh *half[2] = {NULL, NULL};
    int         i;
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, t->n, t->n, 0.3, 0.3, half));
    for (i = 0; i < half[0]->nv; i++) {
        double *x = half[0]->x + 3 * i;
        x[2] -= 0.15;
        x[0] -= 0.15;
        x[1] = 0.006 + 0.05 * fabs(t->tilt) + t->tilt * x[0] * 0.3 +
               2e-4 * touch_noise(t->seed + 31u * (unsigned)i);
    }
    t->mesh = half[0];
    if (t->body != TOUCH_SELF) return;
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 4, 4, 0.2, 0.2, half + 1));
    for (i = 0; i < half[1]->nv; i++) {
        double *x = half[1]->x + 3 * i;
        x[2] -= 0.11;
        x[0] -= 0.09;
        x[1] = -0.001 + 2e-4 * touch_noise(t->seed + 37u * (unsigned)i);
    }
    t->mesh = NULL;
    CHECK(!cloth_mesh_merge(NULL, half, 2, &t->mesh));
    cloth_mesh_destroy(NULL, half[0]);
    cloth_mesh_destroy(NULL, half[1]);
}

/* The body, just below y = 0. */
static inline void touch_obstacle(touch *t) {
    static const double half[3] = {0.11, 0.1, 0.09}, at[3] = {0.01, -0.1, 0.02};
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    cloth_mesh         *bumps = NULL;
    double              still[3] = {0, 0, 0}, spin[3] = {0, 0, 0};
    int                 i;
    if (t->body == TOUCH_SELF) return;
    d.friction = t->friction + touch_moved(t, TOUCH_FRICTION, 1);
    t->body_nv = 1;
    if (t->body == TOUCH_SPHERE || t->body == TOUCH_CAPSULE)
        d.radius = t->body == TOUCH_SPHERE ? 0.1 : 0.06;
    memset(t->body_x, 0, sizeof t->body_x);
    if (t->body == TOUCH_PLANE) {
        d.kind = CLOTH_OBSTACLE_PLANE;
        d.normal[0] = -0.1 * t->tilt;
    } else if (t->body == TOUCH_SPHERE) {
        d.kind = CLOTH_OBSTACLE_SPHERE;
        t->body_x[0] = 0.02, t->body_x[1] = -0.1;
    } else if (t->body == TOUCH_CAPSULE) {
        d.kind = CLOTH_OBSTACLE_CAPSULE;
        t->body_nv = 2;
        t->body_x[0] = -0.08, t->body_x[1] = t->body_x[4] = -0.06, t->body_x[3] = 0.1;
        t->body_x[5] = 0.02;
    } else if (t->body == TOUCH_BOX) {
        d.kind = CLOTH_OBSTACLE_BOX;
        t->body_nv = 8;
        cloth_obstacle_box(at, half, NULL, t->body_x);
    } else {                                /* a hilly sheet */
        CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 7, 7, 0.4, 0.4, &bumps));
        t->body_nv = d.nv = bumps->nv, d.nf = bumps->nf, d.faces = bumps->faces;
        for (i = 0; i < d.nv; i++) {
            const double *x = bumps->x + 3 * i;
            t->body_x[3 * i] = x[0] - 0.2;
            t->body_x[3 * i + 1] = -0.02 + 0.015 * touch_noise(t->seed + 41u * (unsigned)i);
            t->body_x[3 * i + 2] = x[2] - 0.2;
        }
    }
    spin[2] = t->spin;
    d.x = t->body_x;                        /* areas, and so stiffness, are those as added */
    CHECK(!cloth_collide_add(t->c, &d, &t->id));
    if (!t->id.id) exit(2);
    for (i = 0; i < 3 * t->body_nv; i++) t->body_x[i] += touch_moved(t, TOUCH_OBSTACLE, i);
    CHECK(!cloth_collide_teleport(t->c, t->id, t->body_x));
    CHECK(!cloth_collide_set_surface(t->c, t->id, still, spin));
    cloth_mesh_destroy(NULL, bumps);
}

static inline void touch_open(touch *t) {
    cloth_desc         d = cloth_desc_default();
    cloth_collide_desc k = cloth_collide_desc_default();
    cloth_pin          pins[2];
    cloth_state       *s;
    double             g[3] = {0.3, -9.81, 0.2};
    int                i, first = 0;
    touch_sheet(t);
    cloth_desc_set_mesh(&d, t->mesh);
    d.contact = t->body == TOUCH_SELF ? CLOTH_CONTACT_SELF : CLOTH_CONTACT_OBSTACLES;
    d.integrator = t->bdf2 ? CLOTH_INTEGRATOR_BDF2 : CLOTH_INTEGRATOR_EULER;
    if (t->leapfrog) d.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    if (t->hooks) d.hooks = *t->hooks;
    d.substeps = t->leapfrog ? 0 : t->substeps;
    d.max_newton = t->cap;
    d.tolerance = t->tolerance;
    d.cg_tolerance = 1e-4;
    d.linear = CLOTH_LINEAR_CHOLESKY;
    d.material.membrane = 300 + touch_moved(t, TOUCH_MEMBRANE, 0);
    d.material.bending = 1e-4 + touch_moved(t, TOUCH_BENDING, 0);
    d.material.density = 0.2;
    for (i = 0; i < 3; i++) d.gravity[i] = g[i] + touch_moved(t, TOUCH_GRAVITY, i);
    pins[0].vertex = 0, pins[1].vertex = t->n - 1;
    pins[0].axes = pins[1].axes = CLOTH_AXIS_ALL;
    if (t->body == TOUCH_SELF)
        pins[0].vertex = t->mesh->nv - 1, pins[1].vertex = t->mesh->nv - 16;
    if (t->pins || t->body == TOUCH_SELF) d.npins = 2, d.pins = pins;
    CHECK(!cloth_model_create(&d, &t->model) && !cloth_sim_create(t->model, &t->sim));
    k.thickness = 4e-3;
    k.stiffness = 2e5;
    k.slip = 1e-4;
    k.friction = 0.3 + touch_moved(t, TOUCH_FRICTION, 0);
    s = cloth_sim_state(t->sim);
    for (i = 0; i < 3 * t->mesh->nv; i++) {
        s->x[i] += touch_moved(t, TOUCH_X0, i);
        if (t->body == TOUCH_SELF && i / 3 >= t->n * t->n) first = 1;
        s->v[i] = 0.05 * touch_noise(7u * t->seed + (unsigned)i) + touch_moved(t, TOUCH_V0, i);
        if (i % 3 == 1 && !first) s->v[i] -= t->fall;
    }
    cloth_sim_state_changed(t->sim);
    CHECK(!cloth_collide_create(t->sim, &k, &t->c));
    touch_obstacle(t);
}

/* The pose of the body at the end of step k: it slides, and what has corners bends a little. */
static inline void touch_pose(const touch *t, int k, double *x) {
    int i;
    for (i = 0; i < t->body_nv; i++) {
        x[3 * i] = t->body_x[3 * i] + t->speed * t->h * (k + 1);
        x[3 * i + 1] = t->body_x[3 * i + 1] + 1e-4 * (k + 1) * touch_noise(t->seed + (unsigned)i);
        x[3 * i + 2] = t->body_x[3 * i + 2] + 0.3 * t->speed * t->h * (k + 1);
    }
    for (i = 0; i < 3 * t->body_nv; i++)
        x[i] += touch_moved(t, TOUCH_OBSTACLE, 3 * t->body_nv * (k + 1) + i) -
                touch_moved(t, TOUCH_OBSTACLE, i);
}

typedef struct touch_loss {
    double   value;
    int      nv;
    unsigned seed;
} touch_loss;

static inline void touch_loss_at(int k, const double *x, const double *v, double *gx, double *gv,
                                 void *user) {
    touch_loss *u = (touch_loss *)user;
    int         i;
    for (i = 0; i < 3 * u->nv; i++) {
        const double a = touch_noise(u->seed + 900001u + (unsigned)(k * 3 * u->nv + i));
        const double b = 0.01 * touch_noise(u->seed + 1900001u + (unsigned)(k * 3 * u->nv + i));
        u->value += a * x[i] + b * v[i] + 0.5 * x[i] * x[i];
        if (gx) gx[i] += a + x[i];
        if (gv) gv[i] += b;
    }
}

/* The loss of a run; tape: NULL, or made at its start. The sim stays open. */
static inline double touch_run(touch *t, cloth_tape **tape) {
    double       x[3 * 162];
    touch_loss   u;
    cloth_report r;
    int          k;
    memset(&u, 0, sizeof u);
    touch_open(t);
    u.nv = t->mesh->nv;
    u.seed = t->seed;
    if (tape) {
        cloth_tape_options o = cloth_tape_options_default();
        o.bytes = t->bytes;
        if (t->blind) o.early = 0;
        CHECK(!cloth_tape_create(t->sim, &o, tape));
    }
    touch_loss_at(0, cloth_sim_state(t->sim)->x, cloth_sim_state(t->sim)->v, NULL, NULL, &u);
    for (k = 0; k < t->steps; k++) {
        touch_pose(t, k, x);
        if (t->body != TOUCH_SELF) CHECK(!cloth_collide_move(t->c, t->id, x));
        t->failed += cloth_step(t->sim, t->h, &r) != CLOTH_OK;
        t->inexact += r.outcome == CLOTH_STEP_MAX_ITERATIONS;
        t->contacts += r.contacts;
        t->rows += cloth_collide_last(t->c).rows;
        touch_loss_at(k + 1, cloth_sim_state(t->sim)->x, cloth_sim_state(t->sim)->v, NULL, NULL,
                      &u);
    }
    return u.value;
}

static inline double touch_value(const touch *t, int by, double eps, int *failed) {
    touch  q = *t;
    double value;
    q.by = by;
    q.eps = eps;
    value = touch_run(&q, NULL);
    *failed += q.failed + q.inexact;
    touch_close(&q);
    return value;
}

#define TOUCH_LEVELS 7

/* Derivative along the direction of `by`, by Richardson's extrapolation of central differences at
 * eps, eps/4, ..; *error: how far the best two are apart. */
static inline double touch_difference(const touch *t, int by, double eps, double *error,
                                      int *failed) {
    double d[TOUCH_LEVELS][TOUCH_LEVELS], best = 0;
    int    i, j;
    *error = HUGE_VAL;
    for (i = 0; i < TOUCH_LEVELS; i++, eps *= 0.25) {
        double power = 16;
        d[i][0] = (touch_value(t, by, eps, failed) - touch_value(t, by, -eps, failed)) / (2 * eps);
        for (j = 1; j <= i; j++, power *= 16) {
            double off;
            d[i][j] = (power * d[i][j - 1] - d[i - 1][j - 1]) / (power - 1);
            off = fmax(fabs(d[i][j] - d[i][j - 1]), fabs(d[i][j] - d[i - 1][j - 1]));
            if (off < *error) *error = off, best = d[i][j];
        }
    }
    return best;
}

typedef struct touch_results {
    cloth_grad g;
    double     x0[3 * 200], v0[3 * 200], membrane[1], bending[1], gravity[3], friction[2];
    double     obstacle[21 * 3 * 162];      /* [steps + 1 x body_nv x 3]                       */
    int        body_nv;
} touch_results;

static inline void touch_obstacle_result(int k, cloth_obstacle id, const double *g, void *user) {
    touch_results *r = (touch_results *)user;
    (void)id;
    memcpy(r->obstacle + 3 * r->body_nv * k, g, 3 * (size_t)r->body_nv * sizeof *g);
}

static inline void touch_results_open(touch_results *r, const touch *t) {
    memset(r, 0, sizeof *r);
    r->body_nv = t->body_nv;
    r->g.x0 = r->x0, r->g.v0 = r->v0, r->g.membrane = r->membrane, r->g.bending = r->bending;
    r->g.gravity = r->gravity, r->g.friction = r->friction;
    r->g.obstacle = touch_obstacle_result, r->g.user = r;
}

static inline double touch_along(const touch_results *r, const touch *t, int by) {
    const double *a[TOUCH_CAUSES];
    double        sum = 0;
    int           i, j;
    const int     n[TOUCH_CAUSES] = {3 * t->mesh->nv, 3 * t->mesh->nv, 1, 1, 3, 2,
                                     3 * t->body_nv * (t->steps + 1)};
    a[TOUCH_X0] = r->x0, a[TOUCH_V0] = r->v0, a[TOUCH_MEMBRANE] = r->membrane;
    a[TOUCH_BENDING] = r->bending, a[TOUCH_GRAVITY] = r->gravity, a[TOUCH_FRICTION] = r->friction;
    a[TOUCH_OBSTACLE] = r->obstacle;
    for (j = 0; j < TOUCH_CAUSES; j++)
        if (by == j || by == (j < TOUCH_MEMBRANE ? TOUCH_START : TOUCH_REST))
            for (i = 0; i < n[j]; i++) sum += a[j][i] * touch_dir(t, j, i);
    return sum;
}

#endif
