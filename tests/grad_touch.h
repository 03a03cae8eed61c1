/* grad_touch.h - scenes of cloth in contact, by number, for derivatives: a small sheet that falls
 * or is thrown on a body of some kind, which moves; or on itself. `rich`: all other causes at work
 * besides (damping, wind, forces, pins that move, attachments to space, to another face and to the
 * body, a host's term, parts with a friction of their own). What is moved by a cause, the loss and
 * its differences. Include behind clothsim_grad.h, clothsim_collide.h, test.h. */
#ifndef CLOTH_GRAD_TOUCH_H
#define CLOTH_GRAD_TOUCH_H

#include "grad_host.h"

#define TOUCH_ATTACH_MOST 4                 /* desc.max_attachments of what is rich            */

enum { TOUCH_X0, TOUCH_V0, TOUCH_MEMBRANE, TOUCH_BENDING, TOUCH_GRAVITY, TOUCH_FRICTION,
       TOUCH_OBSTACLE, TOUCH_CAUSES, TOUCH_START, TOUCH_REST,     /* the first two; others */
       TOUCH_DENSITY, TOUCH_POISSON, TOUCH_DAMPING, TOUCH_X, TOUCH_THETA0, TOUCH_SCALE, TOUCH_MASS,
       TOUCH_WIND, TOUCH_FORCE, TOUCH_PIN, TOUCH_ATTACH, TOUCH_ATTACH_K, TOUCH_PART, TOUCH_HOST,
       TOUCH_ALL, TOUCH_RICH };             /* all from density on                             */
enum { TOUCH_PLANE, TOUCH_SPHERE, TOUCH_BOX, TOUCH_CAPSULE, TOUCH_MESH, TOUCH_SELF, TOUCH_BODIES };

static const char *const touch_cause[] = {"x0", "v0", "membrane", "bending", "gravity", "friction",
                                          "obstacle", "", "start", "rest", "density",
                                          "poisson", "damping", "X", "theta0", "scale", "mass",
                                          "wind", "force", "pin", "attach", "attach_k", "part",
                                          "host", "", "rich"};
static const char *const touch_body[TOUCH_BODIES] = {"plane", "sphere", "box", "capsule", "mesh",
                                                     "self"};

typedef struct touch {                      /* one run                                         */
    int    body, n, steps, pins, bdf2, substeps;
    int    rich, given;                     /* given: masses                                   */
    size_t bytes;                           /* of the tape                                     */
    const cloth_hooks *hooks;
    int    cap, blind, leapfrog;            /* max_newton; blind: no estimate of early stops   */
    int    grid;                            /* the plane as a distance grid                    */
    double spin, turn;                      /* rad/s about z, of its surface and of the body   */
    double friction, h, tilt, fall, tolerance, speed;
    int    by;                              /* cause that is moved, by eps times its direction */
    double eps;
    unsigned seed;
    cloth_mesh     *mesh;
    cloth_model    *model;
    cloth_sim      *sim;
    cloth_collide  *c;
    cloth_obstacle  id;
    cloth_attachment hook;                  /* to space                                        */
    swarm  host;
    double body_x[3 * 162];                 /* m, as it was added                              */
    int    body_nv, failed, inexact, contacts, rows;
    int    again;                           /* substeps of implicit Euler for BDF2             */
    void (*opened)(cloth_sim *sim);         /* NULL, or called before it runs                  */
} touch;

static inline double touch_noise(unsigned i) {
    i = i * 747796405u + 2891336453u;
    i = ((i >> ((i >> 28) + 4)) ^ i) * 277803737u;
    i = (i >> 22) ^ i;
    return (double)(i >> 8) / 8388608.0 - 1;
}

/* Number i of the direction of a cause, in its unit. */
static inline double touch_dir(const touch *t, int by, int i) {
    static const double size[TOUCH_ALL] = {1e-3, 1e-2, 2, 1e-6, 1e-1, 1e-2, 1e-3, 0, 0, 0, 2e-3,
                                           1e-2, 1e-4, 1e-3, 1e-2, 1e-2, 1e-5, 0.1, 1e-3, 1e-3,
                                           1e-3, 0.1, 1e-2, 0.05};
    const int stays = by == TOUCH_ATTACH ? i % (3 * TOUCH_ATTACH_MOST) > 2   /* not moved there */
                                         : by == TOUCH_PIN && i % (3 * t->mesh->nv) > 2;
    return stays ? 0
                 : size[by] * touch_noise(977u * t->seed + 5003u * (unsigned)by +
                                          131u * (unsigned)i);
}

/* Cause `by` is one of `all`. */
static inline int touch_in(const touch *t, int by, int all) {
    if (by == (t->given ? TOUCH_DENSITY : TOUCH_MASS)) return 0;
    if (by == TOUCH_PIN && (!t->pins || t->body == TOUCH_SELF)) return 0;
    if (by == TOUCH_OBSTACLE && t->body == TOUCH_SELF) return 0;
    return all == by || all == (by < TOUCH_MEMBRANE ? TOUCH_START
                                : by < TOUCH_CAUSES ? TOUCH_REST : TOUCH_RICH);
}

static inline double touch_moved(const touch *t, int by, int i) {
    return touch_in(t, by, t->by) ? t->eps * touch_dir(t, by, i) : 0;
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
    static double     phi[8] = {-0.5, -0.5, 0.5, 0.5, -0.5, -0.5, 0.5, 0.5};
    static cloth_grid half_space = {{2, 2, 2}, {-0.5, -0.5, -0.5}, 1, 0.5, phi};
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
        if (t->grid) d.kind = CLOTH_OBSTACLE_GRID, d.grid = &half_space;
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

/* Of the desc, what a rich scene has besides. */
static inline void touch_rich_desc(const touch *t, cloth_desc *d) {
    static const double wind[3] = {1, -0.3, -0.5};
    int                 i;
    d->material.density += touch_moved(t, TOUCH_DENSITY, 0);
    d->material.poisson = 0.3 + touch_moved(t, TOUCH_POISSON, 0);
    d->material.damping = 5e-3 + touch_moved(t, TOUCH_DAMPING, 0);
    d->max_attachments = TOUCH_ATTACH_MOST;
    d->air_density = 1.2;
    d->lift = 0.3;
    d->wind_on = 1;
    for (i = 0; i < 3; i++) d->wind[i] = wind[i] + touch_moved(t, TOUCH_WIND, i);
}

/* What fits write, and the host's term. */
static inline void touch_rich_params(touch *t) {
    cloth_params *q = cloth_sim_params(t->sim);
    const swarm   pull = {1 + touch_moved(t, TOUCH_HOST, 0), {0.05, -0.2, 0.05}, 0};
    cloth_term    term;
    int           i;
    q->mass_given = t->given;
    for (i = 0; i < q->nv && t->given; i++)
        q->mass[i] = 4e-4 * (1 + 0.2 * touch_noise(77u + (unsigned)i)) +
                     touch_moved(t, TOUCH_MASS, i);
    for (i = 0; i < 6 * q->nf; i++) q->X[i] += touch_moved(t, TOUCH_X, i);
    for (i = 0; i < q->nh; i++) {
        q->theta0[i] += touch_moved(t, TOUCH_THETA0, i);
        q->hinge_scale[i] += touch_moved(t, TOUCH_SCALE, i);
    }
    CHECK(cloth_sim_params_changed(t->sim) == CLOTH_OK);
    t->host = pull;
    term = swarm_term(&t->host);
    CHECK(cloth_sim_add_term(t->sim, &term) == CLOTH_OK);
}

/* Face 5 hangs on a point in space, face 9 on the last but two, face 2 on the body where it has
 * faces; their poses stay where x0 moves. */
static inline void touch_rich_attach(touch *t) {
    static const double at[3] = {0.25, 0.35, 0.4}, to[3] = {0.02, 0.01, 0.01};
    const size_t        bytes = 3 * (size_t)t->mesh->nv * sizeof(double);
    double             *x = cloth_sim_state(t->sim)->x, moved[3 * 200];
    cloth_attachment    id;
    int                 i;
    memcpy(moved, x, bytes);
    for (i = 0; i < 3 * t->mesh->nv; i++) x[i] -= touch_moved(t, TOUCH_X0, i);
    CHECK(!cloth_sim_attach(t->sim, 5, at, 4 + touch_moved(t, TOUCH_ATTACH_K, 0), to, &t->hook));
    CHECK(!cloth_sim_stitch(t->sim, 9, at, 3 + touch_moved(t, TOUCH_ATTACH_K, 1),
                            t->mesh->nf - 3, at, &id));
    if (t->body == TOUCH_MESH || t->body == TOUCH_BOX)
        CHECK(!cloth_collide_attach(t->c, t->id, 6, at, 2, at,
                                    5 + touch_moved(t, TOUCH_ATTACH_K, 2), &id));
    memcpy(x, moved, bytes);
}

/* What the host of a rich scene says before step k. */
static inline void touch_say(const touch *t, int k) {
    static double f[3 * 200];
    double        to[3];
    int           i, n = 3 * t->mesh->nv;
    if (!t->rich) return;
    for (i = 0; i < n; i++)
        f[i] = 1e-4 * touch_noise((unsigned)(7000 + i + n * k)) +
               touch_moved(t, TOUCH_FORCE, n * k + i);
    CHECK(!cloth_sim_set_force(t->sim, f));
    for (i = 0; i < 3; i++)
        to[i] = 0.02 - 1e-3 * k * i + touch_moved(t, TOUCH_ATTACH, 3 * TOUCH_ATTACH_MOST * k + i);
    CHECK(!cloth_sim_attach_move(t->sim, t->hook, to));
    if (t->body == TOUCH_SELF || !t->pins) return;
    for (i = 0; i < 3; i++)
        to[i] = t->mesh->x[i] + 5e-4 * k * (i - 1) + touch_moved(t, TOUCH_PIN, n * k + i);
    CHECK(!cloth_sim_pin(t->sim, 0, CLOTH_AXIS_ALL, to));
}

static inline void touch_open(touch *t) {
    cloth_desc         d = cloth_desc_default();
    cloth_collide_desc k = cloth_collide_desc_default();
    cloth_collide_part part[2];
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
    if (t->rich) touch_rich_desc(t, &d);
    CHECK(!cloth_model_create(&d, &t->model) && !cloth_sim_create(t->model, &t->sim));
    if (t->rich) touch_rich_params(t);
    k.thickness = 4e-3;
    k.stiffness = 2e5;
    k.slip = 1e-4;
    k.friction = 0.3 + touch_moved(t, TOUCH_FRICTION, 0);
    for (i = 0; i < 2 && t->rich; i++) {
        part[i].self = 1, part[i].category = part[i].mask = 0xffffffffu;
        part[i].friction = 0.35 - 0.15 * i + touch_moved(t, TOUCH_PART, i);
        k.nparts = t->body == TOUCH_SELF ? 2 : 1, k.parts = part;
    }
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
    if (t->rich) touch_rich_attach(t);
    if (t->opened) t->opened(t->sim);
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
        touch_say(t, k);
        if (t->body != TOUCH_SELF) CHECK(!cloth_collide_move(t->c, t->id, x));
        if (fabs(t->turn) > 0) {            /* as of cloth_collide_pose, whose x is not moved */
            const double a = t->turn * t->h * (k + 1);
            double      *R = t->c->obstacle[0].turn[1];
            R[0] = R[4] = cos(a), R[3] = sin(a), R[1] = -R[3];
        }
        t->failed += cloth_step(t->sim, t->h, &r) != CLOTH_OK;
        t->inexact += r.outcome == CLOTH_STEP_MAX_ITERATIONS;
        t->contacts += r.contacts;
        t->again += r.restarts;
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
 * eps, eps/4, ..; *error: how far the best two are apart. Digits that agree are not asked again:
 * seven in the long tier, else five, a tenth of what the tests allow. */
static inline double touch_difference(const touch *t, int by, double eps, double *error,
                                      int *failed) {
    const double agree = test_full() ? 1e-7 : 1e-5;
    double       d[TOUCH_LEVELS][TOUCH_LEVELS], best = 0;
    int          i, j;
    *error = HUGE_VAL;
    for (i = 0; i < TOUCH_LEVELS && !(*error < agree * fabs(best)); i++, eps *= 0.25) {
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
    double     density[1], poisson[1], damping[1], X[6 * 128], theta0[256], scale[256], mass[200];
    double     wind[3], force[20 * 3 * 200], pin[20 * 3 * 200], attach[20 * 3 * TOUCH_ATTACH_MOST];
    double     attach_k[TOUCH_ATTACH_MOST], part[2];
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
    if (!t->rich) return;
    r->g.density = r->density, r->g.poisson = r->poisson, r->g.damping = r->damping;
    r->g.X = r->X, r->g.theta0 = r->theta0, r->g.hinge_scale = r->scale, r->g.mass = r->mass;
    r->g.wind = r->wind, r->g.force = r->force, r->g.pin = r->pin, r->g.attach = r->attach;
    r->g.attach_k = r->attach_k, r->g.part_friction = r->part;
}

static inline double touch_along(const touch_results *r, const touch *t, int by) {
    const cloth_params *p = cloth_sim_params(t->sim);
    const int     nv3 = 3 * t->mesh->nv;
    const double *a[TOUCH_ALL] = {
        r->x0, r->v0, r->membrane, r->bending, r->gravity, r->friction, r->obstacle, NULL, NULL,
        NULL, r->density, r->poisson, r->damping, r->X, r->theta0, r->scale, r->mass, r->wind,
        r->force, r->pin, r->attach, r->attach_k, r->part, &t->host.dk};
    const int     n[TOUCH_ALL] = {
        nv3, nv3, 1, 1, 3, 2, 3 * t->body_nv * (t->steps + 1), 0, 0, 0, 1, 1, 1, 6 * p->nf, p->nh,
        p->nh, nv3 / 3, 3, t->steps * nv3, t->steps * nv3, t->steps * 3 * TOUCH_ATTACH_MOST,
        TOUCH_ATTACH_MOST, 2, 1};
    double        sum = 0;
    int           i, j;
    for (j = 0; j < TOUCH_ALL; j++)
        if (touch_in(t, j, by))
            for (i = 0; i < n[j]; i++) sum += a[j][i] * touch_dir(t, j, i);
    return sum;
}

typedef struct touch_graded {               /* a run, its gradient and what it says of itself  */
    touch             t;
    touch_results     r;
    cloth_grad_report rep;
    cloth_status      status;
} touch_graded;

/* bytes: of the tape; 0: what it takes. */
static inline void touch_grade(touch_graded *g, touch t, size_t bytes) {
    cloth_tape *tape = NULL;
    touch_loss  u;
    memset(&u, 0, sizeof u);
    g->t = t;
    g->t.bytes = bytes;
    (void)touch_run(&g->t, &tape);
    CHECK(cloth_tape_steps(tape) == t.steps);
    u.nv = g->t.mesh->nv;
    u.seed = t.seed;
    touch_results_open(&g->r, &g->t);
    g->status = cloth_grad_backward(tape, touch_loss_at, &u, &g->r.g, &g->rep);
    cloth_tape_destroy(tape);
}

#endif
