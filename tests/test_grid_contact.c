/* test_grid_contact.c - a distance grid as an obstacle: rest, differences, friction, motion, impact
 * at speed, the way out from inside, state, refusals.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_grid_contact.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "host.h"
#include "shapes.h"

#define H 0.01
#define T 2e-3
#define G 9.81

typedef struct scene {
    host           h;
    cloth_mesh    *mesh;
    cloth_desc     desc;
    cloth_collide_desc contact;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_state   *state;
    cloth_obstacle id;
} scene;

/* n x n vertices, its corner at (x, y, z). */
static void sheet(scene *s, int n, double size, double x, double y, double z) {
    int i;
    memset(s, 0, sizeof *s);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, size, size, &s->mesh)) exit(2);
    for (i = 0; i < s->mesh->nv; i++) {
        s->mesh->x[3 * i] += x;
        s->mesh->x[3 * i + 1] = y;
        s->mesh->x[3 * i + 2] += z;
    }
    s->desc = cloth_desc_default();
    s->desc.hooks = host_hooks(&s->h);
    s->desc.nv = s->mesh->nv, s->desc.x_rest = s->mesh->x;
    s->desc.nf = s->mesh->nf, s->desc.faces = s->mesh->faces;
    s->desc.material.membrane = 1000, s->desc.material.bending = 1e-5;
    s->desc.material.density = 0.2;
    s->desc.contact = CLOTH_CONTACT_OBSTACLES;
    s->desc.tolerance = 1e-8;
    s->contact = cloth_collide_desc_default();
    s->contact.thickness = T;
}

static void start(scene *s) {
    if (!CHECK(cloth_model_create(&s->desc, &s->model) == CLOTH_OK) ||
        !CHECK(cloth_sim_create(s->model, &s->sim) == CLOTH_OK) ||
        !CHECK(cloth_collide_create(s->sim, &s->contact, &s->c) == CLOTH_OK))
        exit(2);
    s->state = cloth_sim_state(s->sim);
}

static void end(scene *s) {
    cloth_collide_destroy(s->c);
    cloth_sim_destroy(s->sim);
    cloth_model_destroy(s->model);
    CHECK(s->h.live == 0);
    cloth_mesh_destroy(NULL, s->mesh);
}

static cloth_obstacle_desc of_grid(const cloth_grid *g, const double *at, double friction) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    d.kind = CLOTH_OBSTACLE_GRID;
    d.grid = g, d.x = at, d.friction = friction;
    return d;
}

static void add_grid(scene *s, const cloth_grid *g, double x, double y, double z, double mu) {
    double              at[3];
    cloth_obstacle_desc d;
    at[0] = x, at[1] = y, at[2] = z;
    d = of_grid(g, at, mu);
    CHECK(cloth_collide_add(s->c, &d, &s->id) == CLOTH_OK);
}

static cloth_grid *grid_of(shape *m, double cell, double band) {
    cloth_grid_desc d = cloth_grid_desc_default();
    cloth_grid     *g = NULL;
    d.nv = m->nv, d.x = m->x, d.nf = m->nf, d.faces = m->faces;
    d.cell = cell, d.band = band;
    if (!CHECK(cloth_grid_create(&d, &g) == CLOTH_OK)) exit(2);
    shape_free(m);
    return g;
}

/* A box of 1 x 0.2 x 1 m with its top at y = 0. */
static cloth_grid *table(double cell, double band) {
    const double lo[3] = {-0.5, -0.2, -0.5}, hi[3] = {0.5, 0, 0.5};
    shape        m = {0, 0, NULL, NULL};
    shape_box(&m, lo, hi);
    return grid_of(&m, cell, band);
}

/* The half space n.x < 0, filled in by hand: 2 m wide, the band 0.2 m. */
static void slope(cloth_grid *g, const double *n) {
    int i, j, k;
    g->n[0] = g->n[2] = 41, g->n[1] = 31;
    g->cell = 0.05, g->band = 0.2;
    g->origin[0] = g->origin[2] = -1, g->origin[1] = -0.75;
    g->phi = (double *)malloc((size_t)(g->n[0] * g->n[1] * g->n[2]) * sizeof(double));
    if (!g->phi) exit(2);
    for (k = 0; k < g->n[2]; k++)
        for (j = 0; j < g->n[1]; j++)
            for (i = 0; i < g->n[0]; i++) {
                const double d = n[0] * (g->origin[0] + i * g->cell) +
                                 n[1] * (g->origin[1] + j * g->cell) +
                                 n[2] * (g->origin[2] + k * g->cell);
                g->phi[(k * g->n[1] + j) * g->n[0] + i] = fmax(-0.2, fmin(0.2, d));
            }
}

static void steps(scene *s, int n) {
    while (n-- > 0) CHECK(cloth_step(s->sim, H, NULL) == CLOTH_OK);
}

static double lowest(const scene *s) {
    double y = 1e9;
    int    i;
    for (i = 0; i < s->mesh->nv; i++) y = fmin(y, s->state->x[3 * i + 1]);
    return y;
}

static double fastest(const scene *s) {
    double v = 0;
    int    i;
    for (i = 0; i < s->mesh->nv; i++)
        v = fmax(v, sqrt(clothi_dot3(s->state->v + 3 * i, s->state->v + 3 * i)));
    return v;
}

/* --- at rest --- */

/* Contact's force in all, by vertices and by contacts, N along y. */
static double pushed(scene *s, double *touched) {
    static cloth_collide_contact q[1024];
    static double      f[3 * 1024];
    double             sum = 0;
    int                i, n = 0;
    CHECK(cloth_collide_forces(s->c, f) == CLOTH_OK);
    CHECK(cloth_collide_contacts(s->c, 1024, q, &n) == CLOTH_OK);
    for (i = 0; i < s->mesh->nv; i++) sum += f[3 * i + 1];
    for (*touched = 0, i = 0; i < n; i++) {
        CHECK(q[i].pair.obstacle.id == s->id.id && q[i].n == 1);
        CHECK(!(q[i].flags & CLOTH_CONTACT_ROW));
        *touched += q[i].force * q[i].normal[1];
    }
    CHECK(n == s->mesh->nv);
    return sum;
}

/* On a box's grid, moved and with a radius too, as on a plane, but for the pole that a grid has
 * not: with the weight k t/120 on an area, k u^2/t or k u^2/(t (1 - u/U)^2), U = 0.775 t. */
static void rest(void) {
    const double at[3] = {0.013, 0.1 + 0.003, -0.021}, plane[3] = {0, 0.1 + 0.013, 0};
    cloth_grid  *g = table(0.021, 0.1);
    double       height[2] = {0, 0}, gap = 0, weight = 0.2 * 0.4 * 0.4 * G, touched;
    int          k;
    for (k = 0; k < 2; k++) {
        scene               s;
        cloth_obstacle_desc d = of_grid(g, at, 0.3);
        sheet(&s, 7, 0.4, -0.2, plane[1] + 0.004, -0.2);
        start(&s);
        d.radius = 0.01;
        if (k == 0) d.kind = CLOTH_OBSTACLE_PLANE, d.x = plane;
        CHECK(cloth_collide_add(s.c, &d, &s.id) == CLOTH_OK);
        steps(&s, 150);
        height[k] = lowest(&s) - plane[1];
        CHECK_REL(pushed(&s, &touched), weight, 1e-4);
        CHECK_REL(touched, weight, 1e-4);
        CHECK(cloth_collide_gap(s.c, 0.01, &gap) == CLOTH_OK);
        CHECK_NEAR(gap, height[k], 1e-12);
        end(&s);
    }
    printf("    height over a plane %.6f mm, over the grid of a box %.6f mm\n", 1e3 * height[0],
           1e3 * height[1]);
    {
        const double v = T * T / 120, U = 0.75 * T;
        CHECK_REL(T - height[0], sqrt(v) / (1 + sqrt(v) / U), 1e-3);
        CHECK_REL(T - height[1], sqrt(v), 1e-3);
    }
    cloth_grid_destroy(g);
}

/* --- differences --- */

/* Energy and gradient by the interface that the step uses, at depths below the cap, above it, and
 * from outside of the range. The Hessian along the normal: test_friction.c. */
static void differences(void) {
    const double depth[4] = {1.2e-3, -0.4e-3, -0.02, 0.03}, n[3] = {0.6, 0.8, 0};
    const double step = 1e-8;
    cloth_grid   g;
    int          m, i, felt;
    slope(&g, n);
    for (m = 0; m < 4; m++) {
        scene      s;
        cloth_eval e;
        double     x[27], v[27], grad[27], e0, e1, scale = 0;
        sheet(&s, 3, 0.1, 0.1, 0, -0.05);
        s.contact.stiffness = 3e5;
        for (i = 0; i < 9; i++)
            s.mesh->x[3 * i + 1] = (depth[m] + 1e-4 * (i % 4) - n[0] * s.mesh->x[3 * i]) / n[1];
        start(&s);
        add_grid(&s, &g, 0, 0, 0, 0.3);
        for (i = 0; i < 27; i++)
            v[i] = m == 3 ? -4 * n[i % 3] : 0;
        memset(&e, 0, sizeof e);
        e.nv = 9, e.h = H, e.x = x, e.x_n = s.state->x, e.v_n = v, e.grad = grad;
        e.in = &s.sim->in;
        clothi_input(s.sim, H, 0, 1);
        CHECK(clothi_contact_begin(s.c, &e) == CLOTH_OK);
        for (i = 0; i < 27; i++)
            x[i] = s.state->x[i] + H * v[i] + 1e-5 * sin(5.0 * i) +
                   (m == 3 ? 0.0095 * n[i % 3] : 0);
        CHECK(clothi_contact_update(s.c, x, NULL, NULL) == CLOTH_OK);
        CHECK(s.c->ncontact == 9);
        for (i = 0; i < s.c->ncontact; i++) {
            clothi_contact *q = s.c->contact + i;
            q->limit = 0.01, q->slip[2] = 3e-6;
            CHECK_NEAR(q->start, depth[m] + 1e-4 * (q->a % 4), 1e-12);
            CHECK(clothi_dot3(q->normal, n) > 1 - 1e-12);
        }
        memset(grad, 0, sizeof grad);
        CHECK(clothi_contact_eval(s.c, &e, &e0) == CLOTH_OK);
        for (i = 0; i < 27; i++) scale = fmax(scale, fabs(grad[i]));
        e.grad = NULL;
        for (felt = 0, i = 0; i < 27; i++) {
            const double old = x[i];
            x[i] = old + step, CHECK(clothi_contact_eval(s.c, &e, &e1) == CLOTH_OK);
            x[i] = old - step, CHECK(clothi_contact_eval(s.c, &e, &e0) == CLOTH_OK);
            x[i] = old;
            CHECK_NEAR(grad[i], (e1 - e0) / (2 * step), 1e-5 * scale);
            felt += fabs(grad[i]) > 0.1 * scale;
        }
        CHECK(felt >= 9);
        s.c->begun = 0;
        end(&s);
    }
    free(g.phi);
}

/* --- friction, motion --- */

/* Way down a slope of 20 degrees in 0.5 s with mu = part tan a, over that without friction. */
static double slides(double part) {
    const double a = 0.35, n[3] = {sin(a), cos(a), 0};
    cloth_grid   g;
    scene        s;
    double       way, free_way;
    int          i;
    slope(&g, n);
    sheet(&s, 5, 0.1, -0.05, 0, -0.05);
    for (i = 0; i < s.mesh->nv; i++) {
        const double x = s.mesh->x[3 * i];
        s.mesh->x[3 * i] = cos(a) * x + n[0] * 0.9e-3;
        s.mesh->x[3 * i + 1] = -sin(a) * x + n[1] * 0.9e-3;
    }
    s.desc.tolerance = 1e-7;
    start(&s);
    add_grid(&s, &g, 0, 0, 0, part * tan(a));
    steps(&s, 50);
    way = cos(a) * s.state->x[36] - sin(a) * s.state->x[37];
    free_way = 0.5 * G * sin(a) * 0.5 * 0.5;
    end(&s);
    free(g.phi);
    return way / free_way;
}

static void friction(void) {
    const double stick = slides(1.25), slow = slides(0.75), none = slides(0);
    printf("    way over the free one: mu = 1.25 tan a %.5f, 0.75 %.4f, 0 %.4f\n", stick, slow,
           none);
    CHECK(fabs(stick) < 2e-3);
    CHECK_NEAR(slow, 0.25, 0.05);
    CHECK_NEAR(none, 1, 0.04);
}

/* A grid that is moved takes along what lies on it. */
static void carries(void) {
    cloth_grid *g = table(0.04, 0.2);
    scene       s;
    double      at[3] = {0, 0, 0}, x0;
    int         i;
    sheet(&s, 5, 0.2, -0.1, 0.9e-3, -0.1);
    start(&s);
    add_grid(&s, g, 0, 0, 0, 0.6);
    steps(&s, 30);
    x0 = s.state->x[0];
    for (i = 1; i <= 60; i++) {             /* 0.5 m/s^2 to 0.15 m/s, on, and up */
        const double t = i * H;
        at[0] = t < 0.3 ? 0.25 * t * t : 0.0225 + 0.15 * (t - 0.3);
        at[1] = 0.1 * t * t;
        CHECK(cloth_collide_move(s.c, s.id, at) == CLOTH_OK);
        steps(&s, 1);
    }
    printf("    table 67.5 mm on: the cloth %.2f mm\n", 1e3 * (s.state->x[0] - x0));
    CHECK_NEAR(s.state->x[0] - x0, at[0], 1e-3);
    CHECK(lowest(&s) - at[1] > 0.5 * T && lowest(&s) - at[1] < T);
    at[1] = HOST_NAN;
    CHECK(cloth_collide_move(s.c, s.id, at) == CLOTH_ERR_NONFINITE);
    CHECK(strstr(s.h.text, "cloth_collide_move: x[1]") != NULL);
    at[1] = 2;                              /* away: it falls */
    CHECK(cloth_collide_teleport(s.c, s.id, at) == CLOTH_OK);
    steps(&s, 20);
    CHECK(lowest(&s) < -0.05);
    end(&s);
    cloth_grid_destroy(g);
}

/* A surface that moves carries what lies on it wherever the grid's own space begins: with the plane
 * of a contact above that origin, on it and below. */
static void conveyor(void) {
    const double n[3] = {0, 1, 0}, v[3] = {0.5, 0, 0};
    int          k;
    for (k = -1; k < 2; k++) {
        cloth_grid g;
        scene      s;
        slope(&g, n);
        g.origin[1] += 2 * k;
        sheet(&s, 4, 0.1, -0.05, 0.9e-3, -0.05);
        start(&s);
        add_grid(&s, &g, 0, -2 * k, 0, 0.6);
        CHECK(cloth_collide_set_surface(s.c, s.id, v, NULL) == CLOTH_OK);
        steps(&s, 30);
        CHECK_NEAR(fastest(&s), 0.5, 1e-3);
        end(&s);
        free(g.phi);
    }
}

/* --- impact, the way out --- */

/* A sheet thrown at the grid of two spheres that overlap, as one mesh, at 8 m/s, 40 times the
 * thickness a step: vertices stay out of both. */
static void impact(void) {
    const double o[2][3] = {{-0.08, 0, 0}, {0.08, 0, 0.02}}, r = 0.2;
    shape        m = {0, 0, NULL, NULL};
    cloth_grid  *g;
    scene        s;
    double       least = 1;
    int          i, j, k;
    shape_sphere(&m, o[0], r, 60);
    shape_sphere(&m, o[1], r, 60);
    g = grid_of(&m, 0.01, 0.04);
    sheet(&s, 12, 0.4, -0.2, 0.5, -0.2);
    s.desc.tolerance = 1e-6;
    start(&s);
    add_grid(&s, g, 0, 0, 0, 0.3);
    for (i = 0; i < s.mesh->nv; i++) s.state->v[3 * i + 1] = -8;
    cloth_sim_state_changed(s.sim);
    for (k = 0; k < 30; k++) {
        steps(&s, 1);
        for (i = 0; i < s.mesh->nv; i++)
            for (j = 0; j < 2; j++) {
                double d[3];
                clothi_sub3(s.state->x + 3 * i, o[j], d);
                least = fmin(least, sqrt(clothi_dot3(d, d)) - r);
            }
    }
    printf("    vertices at least %.3f mm off the spheres\n", 1e3 * least);
    CHECK(least > -0.5e-3 && least < T);
    end(&s);
    cloth_grid_destroy(g);
}

/* From 30 mm inside, with any relaxation: never above t/max(relaxation, 20 ms), and out. */
static void way_out(void) {
    const double tau[3] = {0, 0.02, 0.05};
    cloth_grid  *g = table(0.02, 0.08);
    int          k, i;
    for (k = 0; k < 3; k++) {
        const double most = T / fmax(tau[k], 0.02);
        scene        s;
        double       speed = 0;
        sheet(&s, 6, 0.3, -0.15, -0.03, -0.15);
        s.contact.relaxation = tau[k];
        s.desc.gravity[1] = 0;
        start(&s);
        add_grid(&s, g, 0, 0, 0, 0.3);
        CHECK(cloth_collide_last(s.c).exempt_pairs == 0);
        for (i = 0; i < 200 && lowest(&s) < 0; i++) {
            steps(&s, 1);
            speed = fmax(speed, fastest(&s));
        }
        printf("    relaxation %.2f s: out after %.2f s, at most %.4f m/s of %.2f\n", tau[k],
               i * H, speed, most);
        CHECK(lowest(&s) > 0);
        CHECK(speed < most * 1.001 && speed > 0.5 * most);
        steps(&s, 100);
        CHECK(lowest(&s) > 0 && lowest(&s) < 2 * most);
        end(&s);
    }
    cloth_grid_destroy(g);
}

/* What leaves by itself is not held back, from whatever depth. */
static void leaves(void) {
    cloth_grid *g = table(0.02, 0.08);
    scene       s;
    int         i, k;
    sheet(&s, 4, 0.2, -0.1, -0.05, -0.1);
    s.desc.gravity[1] = 0;
    start(&s);
    add_grid(&s, g, 0, 0, 0, 0.3);
    for (i = 0; i < s.mesh->nv; i++) s.state->v[3 * i + 1] = 1;
    cloth_sim_state_changed(s.sim);
    for (k = 0; k < 10; k++) {
        steps(&s, 1);
        for (i = 0; i < s.mesh->nv; i++) CHECK_NEAR(s.state->v[3 * i + 1], 1, 1e-9);
    }
    CHECK(lowest(&s) > 0.04);
    end(&s);
    cloth_grid_destroy(g);
}

/* Deeper than the band there is no way out; beside the grid, far from it, there is nothing. */
static void nowhere(void) {
    cloth_grid *g = table(0.02, 0.04);
    scene       s;
    double      place[4][3] = {{-0.05, -0.1, -0.05}, {0.8, 0, 0}, {0, 1e48, 0}, {0, 0.3, 0}};
    int         k, i;
    for (k = 0; k < 4; k++) {
        sheet(&s, 3, 0.1, 0, 0, 0);
        s.desc.gravity[1] = 0;
        start(&s);
        for (i = 0; i < s.mesh->nv; i++)
            if (k == 2) s.state->x[3 * i + 1] = place[k][1] * (1 + i);
        add_grid(&s, g, -place[k][0], k == 2 ? 0 : -place[k][1], -place[k][2], 0.3);
        if (k == 2) {
            cloth_eval e;
            memset(&e, 0, sizeof e);
            e.nv = s.mesh->nv, e.h = H, e.x = e.x_n = s.state->x, e.v_n = s.state->v;
            e.in = &s.sim->in;
            CHECK(clothi_contact_begin(s.c, &e) == CLOTH_OK);
            s.c->begun = 0;
            CHECK(s.c->ncontact == 0);
        } else {
            steps(&s, 2);
            CHECK(cloth_collide_last(s.c).contacts == 0 && !(fastest(&s) > 0));
        }
        end(&s);
    }
    cloth_grid_destroy(g);
}

/* --- books, state --- */

/* The ledger balances while cloth falls on a grid that moves and slides there. */
static void books(void) {
    cloth_grid  *g = table(0.03, 0.1);
    scene        s;
    cloth_report r;
    double       before = 0, rubbed = 0, worked = 0, at[3] = {0, 0, 0};
    int          i;
    sheet(&s, 6, 0.2, -0.1, 0.02, -0.1);
    start(&s);
    add_grid(&s, g, 0, 0, 0, 0.2);
    for (i = 0; i < s.mesh->nv; i++) s.state->v[3 * i] = 1;
    cloth_sim_state_changed(s.sim);
    for (i = 0; i < 40; i++) {
        const cloth_ledger *l = &r.energy;
        at[1] = 1e-3 * i;
        CHECK(cloth_collide_move(s.c, s.id, at) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, &r) == CLOTH_OK);
        if (i > 0)
            CHECK_NEAR(l->total - before, l->contact_work - l->damping_loss - l->friction_loss -
                                              l->zone_loss - l->numerical_loss, 1e-14);
        CHECK(!(fabs(l->zone_loss) > 0) && l->numerical_loss > -1e-9);
        before = l->total;
        rubbed += l->friction_loss, worked += l->contact_work;
    }
    printf("    friction took %.4f J of %.4f J\n", rubbed, 0.5 * 0.2 * 0.04);
    CHECK(rubbed > 1e-3 && rubbed < 0.5 * 0.2 * 0.04 * 1.05);
    CHECK(worked < 0 || worked > 0);
    end(&s);
    cloth_grid_destroy(g);
}

static uint64_t run(const cloth_grid *g, int workers, int snapshot) {
    const double at[3] = {0, 0, 0};
    scene        s;
    host_reverse two;
    uint64_t     hash;
    size_t       size;
    void        *buf;
    sheet(&s, 9, 0.4, -0.3, 0.01, -0.2);
    s.desc.tolerance = 1e-5;
    if (workers == 2) host_turn_round(&s.desc.hooks, &two, 2);
    start(&s);
    add_grid(&s, g, 0.1, 0.1, 0, 0.3);
    CHECK(cloth_collide_move(s.c, s.id, at) == CLOTH_OK);
    steps(&s, 20);
    if (snapshot) {
        size = cloth_sim_save_size(s.sim);
        buf = malloc(size);
        if (!buf) exit(2);
        CHECK(cloth_sim_save(s.sim, buf, size) == CLOTH_OK);
        steps(&s, 7);
        CHECK(cloth_sim_restore(s.sim, buf, size) == CLOTH_OK);
        free(buf);
    }
    if (snapshot > 1) {                     /* and from the start again */
        CHECK(cloth_sim_reset(s.sim) == CLOTH_OK);
        CHECK(cloth_collide_move(s.c, s.id, at) == CLOTH_OK);
        steps(&s, 20);
    }
    CHECK(s.c->nanchor > 0);
    steps(&s, 20);
    hash = cloth_sim_hash(s.sim);
    end(&s);
    return hash;
}

static void same_bits(void) {
    cloth_grid    *g = table(0.03, 0.1);
    const uint64_t hash = run(g, 1, 0);
    CHECK(run(g, 2, 0) == hash);
    CHECK(run(g, 1, 1) == hash);
    CHECK(run(g, 1, 2) == hash);
    cloth_grid_destroy(g);
}

/* --- cost --- */

static double cpu(void *user) {
    (void)user;
    return (double)clock() / CLOCKS_PER_SEC;
}

/* A sheet of 24 x 24 falls on a sphere, as such, as a grid, as a mesh: ms a step. */
static void cost(void) {
    static const char *const name[3] = {"sphere", "grid of it", "mesh of it"};
    const double o[3] = {0, -0.31, 0}, r = 0.3, at[3] = {0, 0, 0};
    shape        m = {0, 0, NULL, NULL}, copy = {0, 0, NULL, NULL};
    cloth_grid  *g;
    double       contact[3];
    int          i, k;
    shape_sphere(&m, o, r, 40);
    shape_sphere(&copy, o, r, 40);
    g = grid_of(&copy, 0.01, 0.04);
    for (k = 0; k < 3; k++) {
        scene               s;
        cloth_obstacle_desc d = of_grid(g, at, 0.3);
        cloth_report        rep;
        double              ms = 0;
        int                 newton = 0;
        sheet(&s, 24, 1, -0.5, 0, -0.5);
        s.desc.tolerance = 1e-4;
        s.desc.hooks.clock.fn = cpu;
        start(&s);
        if (k == 0) d.kind = CLOTH_OBSTACLE_SPHERE, d.x = o, d.radius = r;
        if (k == 2) d.kind = CLOTH_OBSTACLE_MESH, d.nv = m.nv, d.x = m.x;
        if (k == 2) d.nf = m.nf, d.faces = m.faces;
        CHECK(cloth_collide_add(s.c, &d, &s.id) == CLOTH_OK);
        for (contact[k] = 0, i = 0; i < (test_full() ? 90 : test_quick() ? 8 : 15); i++) {
            cloth_collide_report c;
            CHECK(cloth_step(s.sim, 1.0 / 60, &rep) == CLOTH_OK);
            c = cloth_collide_last(s.c);
            ms += rep.ms.total, newton += rep.newton;
            contact[k] += c.ms_begin + c.ms_detect + c.ms_zones;
        }
        printf("    %-10s %6.2f ms a step, of it pairs, detection and zones %5.2f; Newton %.1f\n",
               name[k], ms / i, contact[k] / i, (double)newton / i);
        end(&s);
    }
    CHECK(contact[1] < 0.5 * contact[2]);
    shape_free(&m);
    cloth_grid_destroy(g);
}

/* --- refusals --- */

static void refused(scene *s, const cloth_obstacle_desc *d, cloth_status status, const char *says) {
    cloth_obstacle id;
    const uint64_t hash = cloth_sim_hash(s->sim);
    host_forget(&s->h);
    CHECK(cloth_collide_add(s->c, d, &id) == status && id.id == 0);
    if (!CHECK(strstr(s->h.text, says) != NULL)) printf("    said: %s", s->h.text);
    CHECK(cloth_sim_hash(s->sim) == hash);
}

static void refusals(void) {
    const double        at[3] = {0, 0, 0}, n[3] = {0, 1, 0};
    cloth_grid          g, bad;
    cloth_obstacle_desc d, e;
    scene               s;
    double              old;
    slope(&g, n);
    sheet(&s, 3, 0.1, 0, 0.1, 0);
    start(&s);
    d = of_grid(&g, at, 0.3);
    e = d, e.grid = NULL, refused(&s, &e, CLOTH_ERR_ARGUMENT, "obstacle.grid is NULL");
    e = d, e.x = NULL, refused(&s, &e, CLOTH_ERR_ARGUMENT, "obstacle.x is NULL");
    e = d, e.radius = -1, refused(&s, &e, CLOTH_ERR_ARGUMENT, "obstacle.radius = -1");
    e = d, e.radius = 0.199, refused(&s, &e, CLOTH_ERR_ARGUMENT, "grid->band = 0.2 ");
    e = d, e.thickness = 0.25, refused(&s, &e, CLOTH_ERR_ARGUMENT, "grid->band = 0.2 ");
    e = d, e.friction = HOST_NAN, refused(&s, &e, CLOTH_ERR_NONFINITE, "obstacle.friction");
    e = d, e.kind = (cloth_obstacle_kind)7, refused(&s, &e, CLOTH_ERR_ARGUMENT, "kind = 7");
    e = d, e.grid = &bad;
    bad = g, bad.phi = NULL, refused(&s, &e, CLOTH_ERR_ARGUMENT, "obstacle.grid->phi is NULL");
    bad = g, bad.n[2] = 1, refused(&s, &e, CLOTH_ERR_ARGUMENT, "grid->n[2] = 1");
    bad = g, bad.cell = 0, refused(&s, &e, CLOTH_ERR_ARGUMENT, "grid->cell = 0");
    bad = g, bad.band = HOST_INFINITY, refused(&s, &e, CLOTH_ERR_NONFINITE, "grid->band = inf");
    bad = g, bad.origin[1] = HOST_NAN, refused(&s, &e, CLOTH_ERR_NONFINITE, "origin[1] = NaN");
    old = g.phi[77], g.phi[77] = HOST_NAN;
    refused(&s, &d, CLOTH_ERR_NONFINITE, "grid->phi[77] = NaN");
    g.phi[77] = old;
    CHECK(cloth_collide_add(s.c, &d, &s.id) == CLOTH_OK);
    CHECK(cloth_collide_remove(s.c, s.id) == CLOTH_OK);
    CHECK(cloth_collide_remove(s.c, s.id) == CLOTH_ERR_HANDLE);
    end(&s);
    sheet(&s, 3, 0.1, 0, 0.1, 0);
    s.desc.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    start(&s);
    refused(&s, &d, CLOTH_ERR_UNSUPPORTED, "leapfrog");
    end(&s);
    free(g.phi);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(rest);
    RUN(differences);
    RUN(friction);
    RUN(carries);
    RUN(conveyor);
    RUN(impact);
    RUN(way_out);
    RUN(leaves);
    RUN(nowhere);
    RUN(books);
    RUN(same_bits);
    RUN(cost);
    RUN(refusals);
    return TEST_END();
}
