/* test_untangle.c - cloth that begins inside obstacles and itself is pushed apart, call by call.
 *   cc -std=c99 -O2 -ffp-contract=off -I. test_untangle.c -lm
 * tier: default
 * After every call exact arithmetic (exact.h) lists the pairs of faces that intersect. A pair that
 * was not there before must be beside one that was (a vertex shared on either side), and be counted
 * in report.wandered. SHOW_STEPS=1 prints every call. */
#define CLOTHSIM_IMPLEMENTATION
#include "../clothsim_collide.h"

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
    cloth_status  status;
    double        moved = 0, *x = (double *)malloc(3 * (size_t)s->mesh->nv * sizeof(double));
    const int     n = s->npair;
    int           i, k, stray = 0, fresh;
    if (!x) exit(2);
    memcpy(x, s->state->x, 3 * (size_t)s->mesh->nv * sizeof(double));
    if (n) memcpy(old, s->pair, 2 * (size_t)n * sizeof(int));
    status = cloth_collide_untangle(s->c, most, r);
    fresh = stage_examine(s);
    for (i = 0; i < s->npair; i++)
        stray += !beside(s, old, n, s->pair[2 * i], s->pair[2 * i + 1]);
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
    else CHECK(memcmp(x, s->state->x, 3 * (size_t)s->mesh->nv * sizeof(double)) == 0);
    if (getenv("SHOW_STEPS"))
        printf("    %d -> %d pairs, exact %d, %d fresh %d wandered, %d wrong, depth %.2e, moved "
               "%.2e, %d tries, %s\n", r->before, r->after, s->npair, fresh, r->wandered,
               r->vertices, r->depth, r->moved, r->tries, cloth_status_text(status));
    free(x);
    return status;
}

/* Calls until nothing intersects, at most `most` times; returns how many it took. */
static int untangle(stage *s, const char *name, int most) {
    cloth_untangle_report r;
    cloth_status          status = CLOTH_OK;
    int                   i = 0, first = 0, wandered = 0;
    (void)stage_examine(s);
    memset(&r, 0, sizeof r);
    for (r.after = 1; i < most && r.after && !status; i++) {
        status = call(s, 0, &r);
        if (i == 0) first = r.before;
        wandered += r.wandered;
    }
    CHECK(status == CLOTH_OK);
    CHECK(r.after == 0);
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
        (void)untangle(&s, "ball of faces", 30);
    }
    stage_end(&s);
    shape_free(&ball);
}

static void sphere(void) {
    stage s;
    begin(&s, sheet_of(16, 1, 0, 0, 0));
    if (stage_start(&s)) {
        stage_sphere(&s, 0.5, -0.26, 0.5, 0.3);
        (void)untangle(&s, "sphere", 30);
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
        (void)untangle(&s, "box", 30);
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
        (void)untangle(&s, "a box's corner", 30);
    }
    stage_end(&s);
    shape_free(&b);
}

static void crossing(void) {
    cloth_mesh *a = sheet_of(12, 0.6, 0, 0, 0), *b = sheet_of(10, 0.3, 0.14, 0.303, -0.03);
    stage       s;
    stand(b);
    begin(&s, both(a, b));
    if (stage_start(&s)) (void)untangle(&s, "two sheets that cross", 30);
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
    if (stage_start(&s)) (void)untangle(&s, "a corner", 30);
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
    if (stage_start(&s)) (void)untangle(&s, "a bump", 30);
    stage_end(&s);
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
        CHECK(r.stalled && r.held);
        CHECK(r.before == s.npair && r.after == r.before);
        CHECK(r.pair.faces && r.pair.obstacle.id == s.thing[0].id.id);
        CHECK(cloth_collide_failed(s.c, 0, NULL, &n) == CLOTH_OK);
        CHECK(n == s.npair);
        CHECK(strstr(the_host.text, "pinned") != NULL);
        printf("    %s", the_host.text);
    }
    stage_end(&s);
    shape_free(&b);
}

/* Steps of a tangle that is left alone: what comes to intersect is beside what did, and in the list
 * of what is exempt; parted pairs are not. */
static void wanders(void) {
    static int  old[2 * 4096];
    cloth_mesh *a = sheet_of(12, 0.6, 0, 0, 0), *b = sheet_of(10, 0.4, 0.11, 0.01, 0.13);
    stage       s;
    int         i, k, n, fresh = 0, parted = 0;
    for (i = 0; i < b->nv; i++) {
        double *x = b->x + 3 * i, far = hypot(x[0] - 0.11, x[2] - 0.13);
        x[1] -= 0.03 * exp(-far * far / 0.005);
    }
    begin(&s, both(a, b));
    if (stage_start(&s)) {
        for (i = 0; i < 12 * 12; i++) s.state->v[3 * i + 1] = 0.3 * sin(20 * s.state->x[3 * i]);
        (void)stage_examine(&s);
        for (k = 0; k < 30; k++) {
            n = s.npair;
            memcpy(old, s.pair, 2 * (size_t)n * sizeof(int));
            CHECK(cloth_step(s.sim, 1.0 / 120, NULL) == CLOTH_OK);
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

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(sphere_mesh);
    RUN(sphere);
    RUN(box);
    RUN(box_corner);
    RUN(crossing);
    RUN(corner);
    RUN(bump);
    RUN(pinned);
    RUN(wanders);
    return TEST_END();
}
