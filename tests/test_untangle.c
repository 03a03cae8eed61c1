/* test_untangle.c - cloth that begins inside obstacles and itself is pushed apart, call by call.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_untangle.c -lm
 * tier: default
 * After every call exact arithmetic (exact.h) lists the pairs of faces that intersect. A pair that
 * was not there before must be beside one that was (a vertex shared on either side) or have had a
 * vertex inside of the obstacle, and be counted in report.wandered.
 * SHOW_STEPS=1 in the environment prints every call. */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "shapes.h"
#include "exact.h"
#include "host.h"
#include "stage.h"

#define UNTANGLE_PI 3.14159265358979323846

static host the_host;

/* --- scenes --- */

static cloth_mesh *sheet_of(int n, double size, double x, double y, double z) {
    cloth_mesh *mesh = NULL;
    int         i;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, size, size, &mesh)) exit(2);
    for (i = 0; i < mesh->nv; i++) {
        mesh->x[3 * i] += x;
        mesh->x[3 * i + 1] += y;
        mesh->x[3 * i + 2] += z;
    }
    return mesh;
}

static cloth_mesh *both(cloth_mesh *a, cloth_mesh *b) {
    cloth_mesh *pair[2], *out = NULL;
    pair[0] = a, pair[1] = b;
    if (cloth_mesh_merge(NULL, pair, 2, &out)) exit(2);
    cloth_mesh_destroy(NULL, a);
    cloth_mesh_destroy(NULL, b);
    return out;
}

static void begin(stage *s, cloth_mesh *mesh) {
    stage_cloth(s, mesh);
    s->desc.gravity[1] = 0;
    s->desc.hooks = host_hooks(&the_host);
    s->contact.initial = CLOTH_INITIAL_EXEMPT;
}

/* Upright: the sheet's z becomes height. */
static void stand(cloth_mesh *m) {
    int i;
    for (i = 0; i < m->nv; i++) {
        const double z = m->x[3 * i + 2];
        m->x[3 * i + 2] = m->x[3 * i + 1];
        m->x[3 * i + 1] = z;
    }
}

/* --- calls --- */

static int shares(const stage *s, int f, int g) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (s->faces[3 * f + i] == s->faces[3 * g + j]) return 1;
    return 0;
}

/* Beside one of the n pairs `old`. */
static int beside(const stage *s, const int *old, int n, int f, int g) {
    int i;
    for (i = 0; i < n; i++)
        if ((shares(s, f, old[2 * i]) && shares(s, g, old[2 * i + 1])) ||
            (shares(s, f, old[2 * i + 1]) && shares(s, g, old[2 * i])))
            return 1;
    return 0;
}

/* One call, examined. */
static cloth_status call(stage *s, double most, cloth_untangle_report *r) {
    static int    old[2 * 4096];
    static char   deep[4096];
    cloth_status  status;
    double        moved = 0, *x = (double *)malloc(3 * (size_t)s->mesh->nv * sizeof(double));
    const int     n = s->npair;
    int           i, k, stray = 0, fresh;
    if (!x) exit(2);
    memcpy(x, s->state->x, 3 * (size_t)s->mesh->nv * sizeof(double));
    if (n) memcpy(old, s->pair, 2 * (size_t)n * sizeof(int));
    for (i = 0; i < s->mesh->nv; i++)
        for (deep[i] = 0, k = 0; k < s->nthing; k++)
            if (s->thing[k].nf && s->thing[k].radius <= 0)
                deep[i] |= shape_winding(s->x, s->nf - s->mesh->nf, s->faces + 3 * s->mesh->nf,
                                         x + 3 * i, -1) > 0.5L;
    status = cloth_collide_untangle(s->c, most, r);
    fresh = stage_examine(s);
    for (i = 0; i < s->npair; i++) {
        const int *f = s->faces + 3 * s->pair[2 * i], g = s->pair[2 * i + 1];
        stray += !beside(s, old, n, s->pair[2 * i], g) &&
                 !(g >= s->mesh->nf && (deep[f[0]] || deep[f[1]] || deep[f[2]]));
    }
    CHECK(stray == 0);
    CHECK(fresh <= r->wandered || status != CLOTH_OK);
    for (i = 0; i < s->mesh->nv; i++) {
        double d2 = 0;
        for (k = 0; k < 3; k++) {
            const double d = s->state->x[3 * i + k] - x[3 * i + k];
            d2 += d * d;
        }
        moved = fmax(moved, sqrt(d2));
    }
    if (status == CLOTH_OK) CHECK_NEAR(moved, r->moved, 1e-15);
    if (status == CLOTH_OK && r->before) CHECK(s->c->nanchor == 0);    /* nothing sticks there */
    else CHECK(memcmp(x, s->state->x, 3 * (size_t)s->mesh->nv * sizeof(double)) == 0);
    if (getenv("SHOW_STEPS"))
        printf("    %d -> %d pairs, exact %d, %d fresh %d wandered, moved %.2e, "
               "%d tries, %s\n", r->before, r->after, s->npair, fresh, r->wandered, r->moved,
               r->tries, cloth_status_text(status));
    free(x);
    return status;
}

/* Calls until nothing intersects, at most `most` times, with `steps` steps after each; returns how
 * many it took. */
static int untangle(stage *s, const char *name, int most, int steps) {
    cloth_untangle_report r;
    cloth_status          status = CLOTH_OK;
    int                   i = 0, j, first = 0, wandered = 0;
    (void)stage_examine(s);
    memset(&r, 0, sizeof r);
    for (r.after = 1; i < most && r.after && !status; i++) {
        status = call(s, 0, &r);
        if (i == 0) first = r.before;
        wandered += r.wandered;
        for (j = 0; j < steps && r.after && !status; j++) {
            (void)cloth_collide_step(s->c, 1.0 / 60, 4, NULL);
            memset(s->state->v, 0, 3 * (size_t)s->mesh->nv * sizeof(double));
            (void)stage_examine(s);
        }
    }
    CHECK(status == CLOTH_OK);
    CHECK(r.after == 0);
    CHECK(cloth_collide_last(s->c).exempt_pairs == 0);
    CHECK(s->npair == 0);
    CHECK(first > 0);
    printf("  %-24s %3d pairs, %2d calls, %3d wandered\n", name, first, i, wandered);
    return i;
}

static void sphere_mesh(void) {
    static const double centre[3] = {0.5, -0.26, 0.5};
    shape               ball = {0, 0, NULL, NULL};
    stage               s;
    begin(&s, sheet_of(16, 1, 0, 0, 0));
    shape_sphere(&ball, centre, 0.3, 12);
    if (stage_start(&s)) {
        stage_mesh(&s, &ball, 0.3);
        (void)untangle(&s, "ball of faces", 30, 0);
    }
    stage_end(&s);
    shape_free(&ball);
}

static void sphere(void) {
    stage s;
    begin(&s, sheet_of(16, 1, 0, 0, 0));
    if (stage_start(&s)) {
        stage_sphere(&s, 0.5, -0.26, 0.5, 0.3);
        (void)untangle(&s, "sphere", 30, 0);
        CHECK(stage_clearance(&s, s.thing) > 0);
    }
    stage_end(&s);
}

static void box(void) {
    static const double lo[3] = {0.31, -0.3, 0.33}, hi[3] = {0.72, 0.014, 0.69};
    shape               b = {0, 0, NULL, NULL};
    stage               s;
    begin(&s, sheet_of(16, 1, 0, 0, 0));
    shape_box(&b, lo, hi);
    if (stage_start(&s)) {
        stage_mesh(&s, &b, 0.3);
        (void)untangle(&s, "box", 30, 0);
    }
    stage_end(&s);
    shape_free(&b);
}

static void box_corner(void) {
    static const double lo[3] = {-0.3, -0.3, -0.3}, hi[3] = {0, 0, 0};
    shape               b = {0, 0, NULL, NULL};
    stage               s;
    int                 i;
    begin(&s, sheet_of(6, 1, 0, 0, 0));
    shape_box(&b, lo, hi);
    shape_turn(&b, 0);
    for (i = 0; i < b.nv; i++) b.x[3 * i] += 0.47, b.x[3 * i + 2] += 0.44;
    {
        double top = -1;
        for (i = 0; i < b.nv; i++) top = fmax(top, b.x[3 * i + 1]);
        for (i = 0; i < b.nv; i++) b.x[3 * i + 1] += 0.02 - top;
    }
    if (stage_start(&s)) {
        stage_mesh(&s, &b, 0.3);
        (void)untangle(&s, "a box's corner", 30, 0);
    }
    stage_end(&s);
    shape_free(&b);
}

static void crossing(void) {
    cloth_mesh *a = sheet_of(12, 0.6, 0, 0, 0), *b = sheet_of(10, 0.3, 0.14, 0.303, -0.03);
    stage       s;
    stand(b);
    begin(&s, both(a, b));
    if (stage_start(&s)) (void)untangle(&s, "two sheets that cross", 30, 0);
    stage_end(&s);
}

/* However far they may go, sheets that cross part by an edge a call. (Of 1 m it was stalled, after
 * 80 times the time of 0.1 m; from 1e154 m on, whose square is no number, nothing moved.) */
static void any_way(void) {
    static const double most[] = {1, 1e3, 1e154, 1.7e308};
    double              first[3 * 200], moved = 0;
    size_t              bytes;
    int                 i;
    for (i = 0; i < 4; i++) {
        cloth_mesh *a = sheet_of(9, 0.2, 0, 0, 0), *b = sheet_of(9, 0.2, 0.013, 0.093, -0.061);
        stage       s;
        cloth_untangle_report r;
        stand(b);
        begin(&s, both(a, b));
        bytes = 3 * (size_t)s.mesh->nv * sizeof(double);
        if (stage_start(&s)) {
            (void)stage_examine(&s);
            CHECK(call(&s, most[i], &r) == CLOTH_OK && r.after < r.before && r.moved > 0);
            if (i == 0) memcpy(first, s.state->x, bytes), moved = r.moved;
            CHECK(memcmp(first, s.state->x, bytes) == 0 && moved <= 0.03);
        }
        stage_end(&s);
    }
}

/* What is moved out of a tangle stops at a wire beneath, which no vertex of it meets. */
static void wire(void) {
    const double axis[6] = {0.05, -0.006, 0.29, 0.55, -0.006, 0.29};
    cloth_mesh  *a = sheet_of(12, 0.6, 0, 0, 0), *b = sheet_of(10, 0.3, 0.14, 0.303, -0.03);
    stage        s;
    stand(b);
    begin(&s, both(a, b));
    if (stage_start(&s)) {
        cloth_obstacle_desc d = cloth_obstacle_desc_default();
        d.kind = CLOTH_OBSTACLE_CAPSULE, d.x = axis, d.radius = 0.002;
        stage_add(&s, &d);
        (void)untangle(&s, "the same over a wire", 30, 0);
        CHECK(stage_clearance(&s, s.thing) > 0);
    }
    stage_end(&s);
}

static void corner(void) {
    cloth_mesh *a = sheet_of(12, 0.6, 0, 0, 0), *b = sheet_of(10, 0.4, 0.11, 0.01, 0.13);
    stage       s;
    int         i;
    for (i = 0; i < b->nv; i++) {
        double *x = b->x + 3 * i, far = hypot(x[0] - 0.11, x[2] - 0.13);
        x[1] -= 0.03 * exp(-far * far / 0.005);
    }
    begin(&s, both(a, b));
    if (stage_start(&s)) (void)untangle(&s, "a corner", 30, 0);
    stage_end(&s);
}

static void bump(void) {
    cloth_mesh *a = sheet_of(16, 0.6, 0, 0, 0), *b = sheet_of(15, 0.6, 0.01, 0.01, 0.013);
    stage       s;
    int         i;
    for (i = 0; i < b->nv; i++) {
        double *x = b->x + 3 * i, far = hypot(x[0] - 0.3, x[2] - 0.31);
        x[1] -= 0.04 * exp(-far * far / 0.01);
    }
    begin(&s, both(a, b));
    if (stage_start(&s)) (void)untangle(&s, "a bump", 30, 0);
    stage_end(&s);
}

static void plane_and_capsule(void) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    double              axis[6] = {0.3, -0.08, 0.3, 0.7, -0.08, 0.6};
    stage               s;
    int                 i;
    begin(&s, sheet_of(16, 1, 0, 0, 0));
    for (i = 0; i < s.mesh->nv; i++) s.mesh->x[3 * i + 1] += 0.02 * sin(9 * s.mesh->x[3 * i]);
    d.kind = CLOTH_OBSTACLE_CAPSULE, d.x = axis, d.radius = 0.1;
    if (stage_start(&s)) {
        stage_add(&s, &d);
        stage_plane(&s, -0.012, 0.3);
        (void)untangle(&s, "capsule and plane", 30, 0);
        CHECK(stage_clearance(&s, s.thing + 1) > 0);
    }
    stage_end(&s);
}

/* Between two planes whose outsides do not meet there is nowhere to go: no call says that it got
 * anywhere. */
static void vise(void) {
    cloth_obstacle_desc   d = cloth_obstacle_desc_default();
    double                lid[3] = {0, -0.002, 0};
    cloth_untangle_report r;
    stage                 s;
    begin(&s, sheet_of(8, 0.3, 0, 0, 0));
    if (stage_start(&s)) {
        stage_plane(&s, 0.002, 0.3);
        d.kind = CLOTH_OBSTACLE_PLANE, d.x = lid, d.normal[1] = -1;
        (void)stage_add(&s, &d);
        (void)stage_examine(&s);
        CHECK(call(&s, 0, &r) == CLOTH_ERR_STEP && r.before > 0);
    }
    stage_end(&s);
}

/* A box without one of its faces has no inside: areas say what is wrong. */
static void open_box(void) {
    static const double lo[3] = {0.31, -0.3, 0.33}, hi[3] = {0.72, 0.014, 0.69};
    shape               b = {0, 0, NULL, NULL};
    stage               s;
    begin(&s, sheet_of(16, 1, 0, 0, 0));
    shape_box(&b, lo, hi);
    b.nf--;
    memmove(b.faces, b.faces + 3, 3 * (size_t)b.nf * sizeof(int));
    if (stage_start(&s)) {
        stage_mesh(&s, &b, 0.3);
        s.thing[0].radius = 1;              /* call(): not closed */
        (void)untangle(&s, "open box", 30, 0);
    }
    stage_end(&s);
    shape_free(&b);
}

/* Two cards in each other's slot: the line has an end inside each, no area is cut off. */
static void slotted(void) {
    cloth_mesh *a = sheet_of(10, 0.6, 0, 0, 0), *b = sheet_of(10, 0.6, -0.45, 0.303, -0.27);
    stage       s;
    stand(b);
    begin(&s, both(a, b));
    if (stage_start(&s)) {
        clothi_tangle u;
        int           i;
        memset(&u, 0, sizeof u);
        clothi_world_pose(s.c, s.state->x, 0, 0);
        CHECK(clothi_crossings(s.c) == CLOTH_OK);
        CHECK(clothi_tangle_look(s.c, &u) == CLOTH_OK);
        for (i = 0; i < u.line.n; i++) CHECK(u.line.cut[i].end == -1);
        CHECK(u.line.n > 0);
        clothi_free(s.c->hooks, u.d);
        (void)untangle(&s, "slotted", 120, 0);
    }
    stage_end(&s);
}

/* One sheet folded over, its upper layer dips through the lower. */
static void itself(void) {
    cloth_mesh *m = sheet_of(24, 0.6, 0, 0, 0);
    stage       s;
    int         i;
    begin(&s, m);
    CHECK(cloth_model_create(&s.desc, &s.model) == CLOTH_OK);
    CHECK(cloth_sim_create(s.model, &s.sim) == CLOTH_OK);
    s.state = cloth_sim_state(s.sim);
    for (i = 0; i < m->nv; i++) {
        double      *x = s.state->x + 3 * i;
        const double t = (x[0] - 0.3) / 0.05;
        if (t <= 0) continue;
        x[0] = t < UNTANGLE_PI ? 0.3 + 0.05 * sin(t) : 0.3 - 0.05 * (t - UNTANGLE_PI);
        x[1] = t < UNTANGLE_PI ? 0.05 - 0.05 * cos(t) : 0.1;
        if (t > UNTANGLE_PI) {
            const double far = hypot(x[0] - 0.2, x[2] - 0.3);
            x[1] -= 0.17 * exp(-far * far / 0.004);
        }
    }
    CHECK(cloth_collide_create(s.sim, &s.contact, &s.c) == CLOTH_OK);
    if (s.c) (void)untangle(&s, "itself", 30, 0);
    stage_end(&s);
}

/* A sheet near the middle of a ball: steps between calls give it room. */
static void deep(void) {
    static const double centre[3] = {0.5, -0.1, 0.5};
    shape               ball = {0, 0, NULL, NULL};
    stage               s;
    begin(&s, sheet_of(12, 1, 0, 0, 0));
    shape_sphere(&ball, centre, 0.3, 8);
    if (stage_start(&s)) {
        stage_mesh(&s, &ball, 0.3);
        (void)untangle(&s, "deep, with steps", 80, 1);
    }
    stage_end(&s);
    shape_free(&ball);
}

/* A box through a sheet, another sheet half a millimetre above the box: it has to stay clear, so it
 * is pushed up. What is pinned, the box and the velocities stay; steps after that make no pair. */
static void sandwich(void) {
    static const double   lo[3] = {0.31, -0.3, 0.33}, hi[3] = {0.72, 0.014, 0.69};
    cloth_mesh           *a = sheet_of(12, 0.6, 0.2, 0, 0.2);
    cloth_pin             pins[2] = {{0, CLOTH_AXIS_ALL}, {77, CLOTH_AXIS_X}};
    cloth_untangle_report r;
    shape                 b = {0, 0, NULL, NULL};
    stage                 s;
    double                at[3], was, top = 0;
    int                   i;
    begin(&s, both(a, sheet_of(11, 0.6, 0.21, 0.0145, 0.19)));
    s.desc.npins = 2, s.desc.pins = pins;
    shape_box(&b, lo, hi);
    if (stage_start(&s)) {
        stage_mesh(&s, &b, 0.3);
        memcpy(at, s.state->x, sizeof at);
        was = s.state->x[3 * 77];
        for (i = 0; i < 3 * s.mesh->nv; i++) s.state->v[i] = 1e-3 * i;
        (void)stage_examine(&s);
        CHECK(call(&s, 0.02, &r) == CLOTH_OK);
        CHECK(r.moved > 0.01);
        for (i = 144; i < s.mesh->nv; i++) top = fmax(top, s.state->x[3 * i + 1]);
        CHECK(top > 0.0145 + 1e-4);         /* the sheet above has made room */
        for (i = 0; i < 3 * s.mesh->nv && !(fabs(s.state->v[i] - 1e-3 * i) > 0); i++) continue;
        CHECK(i == 3 * s.mesh->nv);
        (void)untangle(&s, "below another", 30, 0);
        CHECK(memcmp(at, s.state->x, sizeof at) == 0);
        CHECK(memcmp(&was, s.state->x + 3 * 77, sizeof was) == 0);
        memset(s.state->v, 0, 3 * (size_t)s.mesh->nv * sizeof(double));
        for (i = 0; i < 10; i++) (void)stage_step(&s, 1.0 / 60);
        CHECK(s.new_pairs == 0 && s.failed == 0);
    }
    stage_end(&s);
    shape_free(&b);
}

/* A strip that is pinned at both ends, its pins on either side of a box, no vertex between. */
static void pinned(void) {
    static const double   lo[3] = {0.4, -0.1, -0.2}, hi[3] = {0.6, 0.1, 1.2};
    shape                 b = {0, 0, NULL, NULL};
    stage                 s;
    cloth_untangle_report r;
    cloth_pin             pins[4];
    int                   i, n = 0;
    begin(&s, sheet_of(2, 1, 0, 0, 0));
    for (i = 0; i < 4; i++) pins[i].vertex = i, pins[i].axes = CLOTH_AXIS_ALL;
    s.desc.npins = 4, s.desc.pins = pins;
    shape_box(&b, lo, hi);
    if (stage_start(&s)) {
        stage_mesh(&s, &b, 0.3);
        (void)stage_examine(&s);
        CHECK(call(&s, 0, &r) == CLOTH_ERR_STEP);
        CHECK(r.stalled);
        CHECK(r.before == s.npair && r.after == r.before);
        CHECK(r.pair.faces && r.pair.obstacle.id == s.thing[0].id.id);
        CHECK(cloth_collide_failed(s.c, 0, NULL, &n) == CLOTH_OK);
        CHECK(n == s.npair);
        CHECK(strstr(the_host.text, "Pinned") != NULL);
        printf("    %s", the_host.text);
    }
    stage_end(&s);
    shape_free(&b);
}

/* Steps of a tangle that is left alone: what comes to intersect is beside what did, and in the list
 * of what is exempt; parted pairs are not. */
static void wander(cloth_integrator integrator, int steps, double h) {
    static int  old[2 * 4096];
    cloth_mesh *a = sheet_of(12, 0.6, 0, 0, 0), *b = sheet_of(10, 0.4, 0.11, 0.01, 0.13);
    stage       s;
    int         i, k, n, fresh = 0, parted = 0;
    for (i = 0; i < b->nv; i++) {
        double *x = b->x + 3 * i, far = hypot(x[0] - 0.11, x[2] - 0.13);
        x[1] -= 0.03 * exp(-far * far / 0.005);
    }
    begin(&s, both(a, b));
    s.desc.integrator = integrator;
    if (stage_start(&s)) {
        for (i = 0; i < 12 * 12; i++) s.state->v[3 * i + 1] = 0.3 * sin(20 * s.state->x[3 * i]);
        (void)stage_examine(&s);
        for (k = 0; k < steps; k++) {
            n = s.npair;
            memcpy(old, s.pair, 2 * (size_t)n * sizeof(int));
            CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
            fresh += stage_examine(&s);
            for (i = 0; i < n; i++) parted += !stage_has(&s, old[2 * i], old[2 * i + 1]);
            for (i = 0; i < s.npair; i++)
                CHECK(beside(&s, old, n, s.pair[2 * i], s.pair[2 * i + 1]));
            CHECK(cloth_collide_last(s.c).exempt_pairs == s.npair);
        }
        printf("  a tangle left alone: %d came, %d parted, %d left\n", fresh, parted, s.npair);
        CHECK(fresh > 0 && parted > 0);
    }
    stage_end(&s);
}

static void wanders(void) { wander(CLOTH_INTEGRATOR_EULER, 30, 1.0 / 120); }
static void wanders_leapfrog(void) { wander(CLOTH_INTEGRATOR_LEAPFROG, 60, 1.0 / 480); }

/* --- formulas --- */

/* Length of the common part of two triangles in general position: ends are where an edge of one
 * passes the other. */
static long double common_length(const double *x, const int *f, const int *g) {
    long double end[2][3], d2 = 0;
    int         n = 0, side, k, i;
    for (side = 0; side < 2; side++)
        for (k = 0; k < 3; k++) {
            const int    *e = side ? g : f, *t = side ? f : g;
            const double *p = x + 3 * e[k], *q = x + 3 * e[(k + 1) % 3];
            long double   m[3][3], det[4];
            int           j;
            /* p + s (q - p) = a + u (b - a) + v (c - a), by Cramer's rule */
            for (j = 0; j < 4; j++) {
                for (i = 0; i < 3; i++) {
                    const long double a = (long double)x[3 * t[0] + i], r = a - (long double)p[i];
                    m[0][i] = j == 1 ? r : (long double)q[i] - (long double)p[i];
                    m[1][i] = j == 2 ? r : a - (long double)x[3 * t[1] + i];
                    m[2][i] = j == 3 ? r : a - (long double)x[3 * t[2] + i];
                }
                det[j] = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
                         m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
                         m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
            }
            for (j = 1; j < 4; j++) det[j] /= det[0];
            if (det[1] < 0 || det[1] > 1 || det[2] < 0 || det[3] < 0 || det[2] + det[3] > 1)
                continue;
            for (i = 0; i < 3 && n < 2; i++)
                end[n][i] = (long double)p[i] + det[1] * ((long double)q[i] - (long double)p[i]);
            n++;
        }
    if (n != 2) return 0;
    for (i = 0; i < 3; i++) d2 += (end[1][i] - end[0][i]) * (end[1][i] - end[0][i]);
    return sqrtl(d2);
}

/* Length of the lines by the vertices: -dL/dx of every one against central differences of
 * common_length. */
static void shortening(void) {
    cloth_mesh *a = sheet_of(7, 0.6, 0, 0, 0), *b = sheet_of(7, 0.6, -0.231, 0.303, -0.263);
    stage       s;
    clothi_contour cuts;
    const int   fa = a->nf;
    double     *g, moving = 0;
    int         i, j, k, n;
    stand(b);
    for (i = 0; i < b->nv; i++) {           /* nothing aligned */
        double *x = b->x + 3 * i, y = x[1];
        x[1] = y + 0.13 * x[0] + 0.003;
        x[2] += 0.21 * y + 0.02 * sin(7 * x[0]);
    }
    for (i = 0; i < a->nv; i++)
        a->x[3 * i + 1] += 0.03 * sin(5 * a->x[3 * i] + 3 * a->x[3 * i + 2]);
    memset(&cuts, 0, sizeof cuts);
    begin(&s, both(a, b));
    g = (double *)calloc(3 * (size_t)s.mesh->nv, sizeof(double));
    if (!g) exit(2);
    if (!stage_start(&s)) goto done;
    clothi_world_pose(s.c, s.state->x, 0, 0);
    CHECK(clothi_crossings(s.c) == CLOTH_OK);
    cuts.cut = (clothi_crossing *)clothi_alloc(&s.desc.hooks, 6 * (size_t)s.c->nnow,
                                               sizeof *cuts.cut);
    if (!cuts.cut) exit(2);
    for (i = 0; i < s.c->nnow; i++) clothi_contour_find(s.c, s.c->now + i, &cuts);
    CHECK(cuts.n > 10);
    clothi_contour_shrink(s.c, &cuts, g);
    for (n = 0, i = 0; i < 3 * s.mesh->nv; i++) {
        const double step = 1e-7;
        long double  length[2] = {0, 0};
        if (!(fabs(g[i]) > 0) && i % 7) continue;
        for (k = 0; k < 2; k++) {
            memcpy(s.x, s.state->x, 3 * (size_t)s.mesh->nv * sizeof(double));
            s.x[i] += k ? step : -step;
            for (j = 0; j < s.c->nnow; j++)
                length[k] += common_length(s.x, s.faces + 3 * s.c->now[j].a,
                                           s.faces + 3 * s.c->now[j].b);
        }
        CHECK(s.c->now[0].a < fa);
        CHECK_NEAR((length[0] - length[1]) / (2 * (long double)step), g[i], 1e-6);
        moving = fmax(moving, fabs(g[i]));
        n += fabs(g[i]) > 1e-3;
    }
    CHECK(moving > 0.1 && n > 30);
done:
    clothi_free(&s.desc.hooks, cuts.cut);
    free(g);
    stage_end(&s);
}

/* --- the call --- */

static void begin_ball(stage *s, shape *ball) {
    static const double centre[3] = {0.5, -0.26, 0.5};
    begin(s, sheet_of(10, 1, 0, 0, 0));
    shape_sphere(ball, centre, 0.3, 6);
}

static void arguments(void) {
    shape                 ball = {0, 0, NULL, NULL};
    stage                 s;
    cloth_untangle_report r;
    double                keep;
    uint64_t              hash;
    memset(&r, 1, sizeof r);
    CHECK(cloth_collide_untangle(NULL, 0, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(r.before == 0);
    begin_ball(&s, &ball);
    if (stage_start(&s)) {
        CHECK(cloth_collide_untangle(s.c, 0, &r) == CLOTH_OK);      /* nothing there yet */
        CHECK(r.before == 0 && r.after == 0 && r.tries == 0 && r.moved == 0);
        stage_mesh(&s, &ball, 0.3);
        hash = cloth_sim_hash(s.sim);
        CHECK(cloth_collide_untangle(s.c, -1, &r) == CLOTH_ERR_ARGUMENT);
        CHECK(cloth_collide_untangle(s.c, (double)NAN, &r) == CLOTH_ERR_NONFINITE);
        CHECK(cloth_collide_untangle(s.c, (double)INFINITY, &r) == CLOTH_ERR_NONFINITE);
        CHECK(strstr(the_host.text, "max_move") != NULL);
        CHECK(cloth_sim_hash(s.sim) == hash);
        keep = s.state->x[7];
        s.state->x[7] = (double)NAN;
        CHECK(cloth_collide_untangle(s.c, 0, &r) == CLOTH_ERR_NONFINITE);
        CHECK(strstr(the_host.text, "x[7]") != NULL);
        s.state->x[7] = keep;
        CHECK(cloth_sim_hash(s.sim) == hash);
        CHECK(cloth_collide_untangle(s.c, 1e9, NULL) == CLOTH_OK);
        CHECK(cloth_sim_hash(s.sim) != hash);
    }
    stage_end(&s);
    shape_free(&ball);
}

/* Under REFUSE a host that wrote a state which intersects gets it untangled; until then no step. */
static void refused(void) {
    static const double   centre[3] = {0.5, -0.31, 0.5};
    shape                 ball = {0, 0, NULL, NULL};
    stage                 s;
    cloth_untangle_report r;
    int                   i;
    begin(&s, sheet_of(10, 1, 0, 0, 0));
    s.contact.initial = CLOTH_INITIAL_REFUSE;
    shape_sphere(&ball, centre, 0.3, 6);
    if (stage_start(&s)) {
        stage_mesh(&s, &ball, 0.3);
        CHECK(cloth_step(s.sim, 1e-3, NULL) == CLOTH_OK);
        for (i = 0; i < s.mesh->nv; i++) s.state->x[3 * i + 1] -= 0.04;
        CHECK(cloth_step(s.sim, 1e-3, NULL) == CLOTH_ERR_STEP);
        for (i = 0, r.after = 1; i < 30 && r.after; i++) {
            CHECK(cloth_collide_untangle(s.c, 0, &r) == CLOTH_OK);
            CHECK((cloth_step(s.sim, 1e-3, NULL) == CLOTH_OK) == (r.after == 0));
        }
        CHECK(r.after == 0 && i > 1);
    }
    stage_end(&s);
    shape_free(&ball);
}

/* A step before the call leaves nothing that the call sees: state alone counts. */
static void after_step(void) {
    stage    s;
    uint64_t hash[2];
    size_t   size;
    void    *kept;
    int      k, i;
    for (k = 0; k < 2; k++) {
        cloth_mesh *a = sheet_of(8, 0.2, 0, 0, 0), *b = sheet_of(8, 0.2, 0.01, 7e-4, 0);
        for (i = 0; i < b->nv; i++) b->x[3 * i + 1] += 0.05 * (b->x[3 * i] - 0.04);
        begin(&s, both(a, b));
        s.contact.thickness = 2e-3;
        if (!stage_start(&s)) exit(2);
        (void)stage_plane(&s, -3e-4, 0.3);
        size = cloth_sim_save_size(s.sim);
        kept = malloc(size);
        if (!kept) exit(2);
        CHECK(cloth_sim_save(s.sim, kept, size) == CLOTH_OK);
        if (k) CHECK(cloth_step(s.sim, 1e-2, NULL) == CLOTH_OK);
        CHECK(cloth_sim_restore(s.sim, kept, size) == CLOTH_OK);
        free(kept);
        CHECK(cloth_collide_untangle(s.c, 0, NULL) == CLOTH_OK);
        hash[k] = cloth_sim_hash(s.sim);
        stage_end(&s);
    }
    CHECK(hash[0] == hash[1]);
}

/* A host moves cloth that sticks to a plane, where nothing intersects: a call forgets as much as a
 * step by itself does. */
static void moved_by_host(void) {
    stage  s;
    double after[2] = {0, 0};
    int    k, i;
    for (k = 0; k < 2; k++) {
        begin(&s, sheet_of(9, 0.2, 0, 0, 0));
        s.desc.gravity[0] = 2, s.desc.gravity[1] = -9.81, s.desc.sleep = 0;
        if (!stage_start(&s)) exit(2);
        (void)stage_plane(&s, -3e-3, 1);
        for (i = 0; i < 30; i++) CHECK(cloth_step(s.sim, 1.0 / 60, NULL) == CLOTH_OK);
        CHECK(s.c->nanchor > 0);
        for (i = 0; i < s.mesh->nv; i++) s.state->x[3 * i] += 0.05;
        cloth_sim_state_changed(s.sim);
        if (k) CHECK(cloth_collide_untangle(s.c, 0, NULL) == CLOTH_OK && s.c->nanchor == 0);
        CHECK(cloth_step(s.sim, 1.0 / 60, NULL) == CLOTH_OK);
        after[k] = s.state->x[0];
        stage_end(&s);
    }
    CHECK_NEAR(after[0], after[1], 0);
}

/* Every allocation of a call fails once: the state is as before, nothing is lost. */
static void memory(void) {
    shape                 ball = {0, 0, NULL, NULL};
    stage                 s;
    cloth_untangle_report r;
    cloth_status          status = CLOTH_ERR_MEMORY;
    uint64_t              hash;
    int                   k, live;
    begin_ball(&s, &ball);
    if (stage_start(&s)) {
        stage_mesh(&s, &ball, 0.3);
        hash = cloth_sim_hash(s.sim);
        live = the_host.live;
        for (k = 1; k < 500 && status; k++) {
            the_host.calls = 0, the_host.fail_at = k;
            status = cloth_collide_untangle(s.c, 0, &r);
            CHECK(status == CLOTH_OK || status == CLOTH_ERR_MEMORY);
            if (status) CHECK(cloth_sim_hash(s.sim) == hash);
        }
        the_host.fail_at = 0;
        CHECK(status == CLOTH_OK && k > 8);
        CHECK(the_host.live <= live + 12);  /* lists that have grown are kept */
    }
    stage_end(&s);
    CHECK(the_host.live == 0);
    shape_free(&ball);
}

/* The same bits: again, from a snapshot taken on the way, and for ranges run backwards. */
static void same_bits(void) {
    shape        ball = {0, 0, NULL, NULL};
    uint64_t     hash[3] = {0, 1, 2};
    host_reverse five = {5, 0};
    int          k, i;
    for (k = 0; k < 3; k++) {
        stage  s;
        void  *kept;
        begin_ball(&s, &ball);
        if (k == 2) host_turn_round(&s.desc.hooks, &five, 5);
        if (stage_start(&s)) {
            stage_mesh(&s, &ball, 0.3);
            for (i = 0; i < 4; i++) {
                const size_t size = cloth_sim_save_size(s.sim);
                if (k == 1 && i == 2) {
                    kept = malloc(size);
                    if (!kept) exit(2);
                    CHECK(cloth_sim_save(s.sim, kept, size) == CLOTH_OK);
                    CHECK(cloth_collide_untangle(s.c, 0, NULL) == CLOTH_OK);
                    CHECK(cloth_sim_restore(s.sim, kept, size) == CLOTH_OK);
                    free(kept);
                }
                CHECK(cloth_collide_untangle(s.c, 0, NULL) == CLOTH_OK);
                CHECK(cloth_step(s.sim, 1e-3, NULL) == CLOTH_OK);
            }
            hash[k] = cloth_sim_hash(s.sim);
        }
        stage_end(&s);
        shape_free(&ball);
    }
    CHECK(five.ranges > 0);
    CHECK(hash[0] == hash[1]);
    CHECK(hash[0] == hash[2]);
}

/* Turned about the axis z, then about x, and set off: coordinates that round. */
static void tilt(double *x, int n, double turn) {
    int i;
    for (i = 0; i < n; i++) {
        double      *p = x + 3 * i;
        const double a = cos(turn) * p[0] - sin(turn) * p[1];
        const double b = sin(turn) * p[0] + cos(turn) * p[1];
        p[0] = a + 0.7;
        p[1] = cos(0.3 * turn) * b - sin(0.3 * turn) * p[2] - 1.1;
        p[2] = sin(0.3 * turn) * b + cos(0.3 * turn) * p[2] + 0.4;
    }
}

enum { ON_BOX, ON_PLANE, ON_COPY, ON_SPHERE, ON_EDGE, STACKED, BENT, OVERLAPPED, TOUCHING };

/* A sheet laid on something exactly, or `gap` above it; *x [at least 3 x 25]: of the obstacle. */
static cloth_mesh *laid(int kind, double gap, double turn, cloth_obstacle_desc *d, double *x) {
    const double at[3] = {0, -0.1, 0}, half[3] = {0.25, 0.1, 0.25}, up[6] = {0, 0, 0, 0, 1, 0};
    const double s = sqrt(0.5), edge[3] = {0, -0.35 * s, 0};
    const double turned[9] = {1, 0, 0, 0, s, s, 0, -s, s};
    cloth_mesh  *m = sheet_of(5, 0.3, -0.15, gap, -0.15);
    double       n[6];
    int          i;
    *d = cloth_obstacle_desc_default();
    if (kind == STACKED || kind == BENT) m = both(sheet_of(5, 0.3, -0.15, 0, -0.15), m);
    if (kind == OVERLAPPED) m = both(sheet_of(4, 0.2, 0.03, 0, -0.02), m);
    memcpy(n, up, sizeof n);
    tilt(n, 2, turn);
    memset(x, 0, 6 * sizeof *x);
    d->kind = kind == ON_BOX || kind == ON_EDGE ? CLOTH_OBSTACLE_BOX
              : kind == ON_PLANE ? CLOTH_OBSTACLE_PLANE
              : kind == ON_SPHERE ? CLOTH_OBSTACLE_SPHERE : CLOTH_OBSTACLE_MESH;
    clothi_sub3(n + 3, n, d->normal);
    d->radius = kind == ON_SPHERE ? 0.2 : 0;
    for (i = 0; i < m->nv; i++) {           /* folds, and an edge across an edge */
        double *p = m->x + 3 * i;
        if (kind == BENT) p[1] += 0.03 * sin(20 * p[0]) * cos(15 * p[2]);
        if (kind == ON_EDGE) p[1] += 0.7 * fabs(p[0]);
    }
    if (kind == ON_BOX) cloth_obstacle_box(at, half, NULL, x);
    if (kind == ON_EDGE) cloth_obstacle_box(edge, half, turned, x);
    if (kind == ON_SPHERE) x[1] = -0.2;
    if (kind == ON_COPY)
        memcpy(x, m->x, 75 * sizeof *x), d->nv = m->nv, d->nf = m->nf, d->faces = m->faces;
    tilt(x, kind == ON_COPY ? 25 : 8, turn);
    tilt(m->x, m->nv, turn);
    d->x = x;
    return m;
}

/* What begins with no gap, or with one that is next to none, is refused with what to do about it;
 * let in, the same pairs however small the gap, it is pushed to 0.4 t in one call, and stays
 * apart. */
static void touching(void) {
    static const double gap[4] = {0, 1e-16, 1e-14, 1e-9};
    int                 kind, i, k, n, pairs = 0;
    for (kind = 0; kind < TOUCHING; kind++)
        for (i = 0; i < 8; i++) {
            cloth_untangle_report r;
            cloth_obstacle_desc   d;
            cloth_obstacle        id;
            cloth_status          status;
            double                x[75], least = 0;
            const int             lone = kind >= STACKED;
            stage                 s;
            begin(&s, laid(kind, gap[i / 2], i % 2 ? 0.1 + 0.2 * i : 0, &d, x));
            s.desc.gravity[1] = -9.81;
            s.contact.initial = CLOTH_INITIAL_REFUSE;
            CHECK(!cloth_model_create(&s.desc, &s.model) && !cloth_sim_create(s.model, &s.sim));
            status = cloth_collide_create(s.sim, &s.contact, &s.c);
            if (!lone) status = status ? CLOTH_OK : cloth_collide_add(s.c, &d, &id);
            CHECK(status == CLOTH_ERR_MESH && strstr(the_host.text, "cloth_collide_untangle"));
            cloth_collide_destroy(s.c);
            s.contact.initial = CLOTH_INITIAL_EXEMPT;
            CHECK(cloth_collide_create(s.sim, &s.contact, &s.c) == CLOTH_OK);
            CHECK(lone || cloth_collide_add(s.c, &d, &id) == CLOTH_OK);
            if (i == 0) pairs = cloth_collide_last(s.c).exempt_pairs;
            CHECK(pairs > 0 && cloth_collide_last(s.c).exempt_pairs == pairs);
            CHECK(cloth_collide_untangle(s.c, 0, &r) == CLOTH_OK);
            CHECK(r.after == 0 && cloth_collide_last(s.c).exempt_pairs == 0);
            CHECK(!cloth_collide_gap(s.c, 0.1, &least) && least > 0.39 * s.contact.thickness);
            s.state = cloth_sim_state(s.sim);
            for (k = 0; k < 10; k++) {
                CHECK(cloth_step(s.sim, 1.0 / 60, NULL) == CLOTH_OK);
                CHECK(stage_examine(&s) == 0 && s.npair == 0);
                CHECK(!cloth_collide_intersections(s.c, 0, NULL, &n) && n == 0);
                CHECK(!cloth_collide_gap(s.c, 0.1, &least) && least > 0.25 * s.contact.thickness);
            }
            stage_end(&s);
        }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(sphere_mesh);
    RUN(sphere);
    RUN(box);
    RUN(box_corner);
    RUN(crossing);
    RUN(any_way);
    RUN(wire);
    RUN(corner);
    RUN(bump);
    RUN(plane_and_capsule);
    RUN(vise);
    RUN(open_box);
    RUN(slotted);
    RUN(itself);
    RUN(deep);
    RUN(sandwich);
    RUN(pinned);
    RUN(wanders);
    RUN(wanders_leapfrog);
    RUN(shortening);
    RUN(arguments);
    RUN(refused);
    RUN(moved_by_host);
    RUN(memory);
    RUN(same_bits);
    RUN(after_step);
    RUN(touching);
    return TEST_END();
}
