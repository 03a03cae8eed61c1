/* test_convex.c - closed convex bodies that are flagged self_penetrating hold cloth like others.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. test_convex.c -lm
 *
 * A convex body penetrates itself nowhere and no two parts of it face each other: the flag must
 * change nothing, no bit of it, and no accepted step may end with cloth that crosses the body,
 * however fast it moved. Crossings are counted by exact arithmetic over all pairs (exact.h), the
 * exempt ones too: a pair that the kit lets go is a crossing, and the kit must count it as one.
 *
 *   sweep    ball, box and capsule, 0.15 to 0.6 m a step, to and fro through a sheet of 0.6 m that
 *            hangs from two corners. A step that fails leaves the body where it was
 *   press    the same, pressing a sheet against a fixed box from above, to 1 mm and past it */
#include "../clothsim_collide.h"

#include "test.h"
#include "shapes.h"
#include "exact.h"
#include "stage.h"

enum { BALL, BOX, CAPSULE, BODIES };

static const char *const body_name[BODIES] = {"ball", "box", "capsule"};

/* About the origin, 0.1 m from middle to front along z, turned so that nothing is aligned. */
static void body_make(shape *m, int kind) {
    static const double o[3] = {0, 0, 0}, lo[3] = {-0.1, -0.08, -0.09}, hi[3] = {0.1, 0.08, 0.09};
    int                 i;
    if (kind == BOX) shape_box(m, lo, hi);
    else shape_sphere(m, o, kind == BALL ? 0.1 : 0.07, kind == BALL ? 8 : 7);
    for (i = 0; kind == CAPSULE && i < m->nv; i++)      /* 7 is odd: no ring at z = 0 */
        m->x[3 * i + 2] += m->x[3 * i + 2] < 0 ? -0.08 : 0.08;
    shape_turn(m, 0);
}

static int body_add(stage *s, const shape *m, const double *at, int flag) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    double             *x = (double *)malloc(3 * (size_t)m->nv * sizeof(double));
    int                 i, id;
    if (!x) exit(2);
    for (i = 0; i < 3 * m->nv; i++) x[i] = m->x[i] + at[i % 3];
    d.nv = m->nv, d.nf = m->nf, d.faces = m->faces, d.x = x;
    d.self_penetrating = flag;
    id = stage_add(s, &d);
    free(x);
    return id;
}

typedef struct tried {                      /* of one run                                      */
    int    accepted, failed, crossed, most; /* steps, those that end with crossings; pairs     */
    int    miscounted;                      /* steps whose crossings the kit counts otherwise  */
    double *trail;                          /* [steps x nv x 6] x and v after each step        */
} tried;

static void tried_free(tried *t) { free(t->trail); }

/* One step with the body's middle on its way to `to`; *at: where it is. */
static void attempt(stage *s, int id, const shape *m, double *at, const double *to, tried *t) {
    cloth_report r;
    const size_t n = 3 * (size_t)s->mesh->nv;
    double      *out = t->trail + 2 * n * (size_t)(t->accepted + t->failed);
    int          i, pairs;
    for (i = 0; i < 3 * m->nv; i++) s->thing[id].next[i] = m->x[i] + to[i % 3];
    CHECK(cloth_collide_move(s->c, s->thing[id].id, s->thing[id].next) == CLOTH_OK);
    (void)cloth_step(s->sim, 1.0 / 60, &r);
    stage_count(s, &r);
    if (r.status == CLOTH_OK) {
        memcpy(s->thing[id].x, s->thing[id].next, 3 * (size_t)m->nv * sizeof(double));
        memcpy(at, to, 3 * sizeof(double));
        t->accepted++;
        (void)stage_examine(s);
        pairs = stage_crossings(s);
        t->crossed += pairs > 0;
        t->miscounted += !stage_parity(s);
        t->most = pairs > t->most ? pairs : t->most;
    } else {
        t->failed++;
    }
    if (getenv("SHOW_STEPS")) {
        const cloth_collide_report k = cloth_collide_last(s->c);
        printf("      z %6.3f %s newton %d halv %d passes %d zones %d rows %d rigid %d contacts %d "
               "%.0f ms, zones %.0f\n", to[2], r.status ? "failed" : "ok", r.newton, r.halvings,
               k.passes, k.zones, k.rows, k.rigid_zones, k.contacts, r.ms.total, k.ms_zones);
        fflush(stdout);
    }
    memcpy(out, s->state->x, n * sizeof(double));
    memcpy(out + n, s->state->v, n * sizeof(double));
}

/* Upright in z = 0; desc is still to be started. */
static void hang(stage *s, int n) {
    int i;
    stage_sheet(s, n, 0.6);
    s->desc.hooks.log.fn = NULL;
    for (i = 0; i < s->mesh->nv; i++) {
        double *x = s->mesh->x + 3 * i;
        x[0] -= 0.3;
        x[1] = 0.3 - x[2];
        x[2] = 0.002 * sin(9 * x[0]);
    }
}

/* To and fro along z through the sheet, `stride` a step, 6 steps each way. */
static tried sweep(int kind, double stride, int flag, int steps) {
    tried  t = {0, 0, 0, 0, 0, NULL};
    shape  m = {0, 0, NULL, NULL};
    stage  s;
    double at[3] = {0.03, 0.02, -0.35}, to[3];
    int    i, id;
    hang(&s, 10);
    body_make(&m, kind);
    t.trail = (double *)calloc(6 * (size_t)(steps * s.mesh->nv), sizeof(double));
    if (!t.trail) exit(2);
    if (stage_start(&s)) {
        CHECK(cloth_sim_pin(s.sim, 0, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
        CHECK(cloth_sim_pin(s.sim, 9, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
        id = body_add(&s, &m, at, flag);
        for (i = 0; i < steps; i++) {
            const int back = at[2] > 0.35 || (at[2] > -0.3 && i % 6 >= 3);
            memcpy(to, at, sizeof to);
            to[0] += 0.01 * (i % 3 - 1);
            to[2] += back ? -stride : stride;
            attempt(&s, id, &m, at, to, &t);
        }
    }
    stage_end(&s);
    shape_free(&m);
    return t;
}

/* The sheet lies on a box of 0.2 m; the body comes down on it, 15 mm a step, through the box. */
static tried press(int kind, int flag, int steps) {
    static const double lo[3] = {-0.1, -0.2, -0.1}, hi[3] = {0.1, -0.0015, 0.1};
    tried  t = {0, 0, 0, 0, 0, NULL};
    shape  m = {0, 0, NULL, NULL}, table = {0, 0, NULL, NULL};
    stage  s;
    double at[3] = {0.01, 0.19, 0.02}, to[3];
    int    i, id;
    stage_sheet(&s, 10, 0.4);
    s.desc.hooks.log.fn = NULL;
    for (i = 0; i < s.mesh->nv; i++) s.mesh->x[3 * i] -= 0.2, s.mesh->x[3 * i + 2] -= 0.2;
    body_make(&m, kind);
    shape_box(&table, lo, hi);
    t.trail = (double *)calloc(6 * (size_t)(steps * s.mesh->nv), sizeof(double));
    if (!t.trail) exit(2);
    if (stage_start(&s)) {
        stage_mesh(&s, &table, 0.3);
        id = body_add(&s, &m, at, flag);
        for (i = 0; i < steps; i++) {
            memcpy(to, at, sizeof to);
            to[1] -= i < steps / 2 ? 0.015 : -0.03;
            to[0] += 0.004 * (i % 2);
            attempt(&s, id, &m, at, to, &t);
        }
    }
    stage_end(&s);
    shape_free(&m);
    shape_free(&table);
    return t;
}

static void title(void) {
    printf("    scene  m/step body     accepted failed  crossed  pairs  flag on is flag off\n");
}

/* Runs with the flag and without it, and counts: the steps accepted and crossed with it. */
static void judge(tried on, tried off, const char *scene, double stride, int kind, int nv,
                  int steps, int *crossed, int *differ, int *miscounted) {
    const int same = memcmp(on.trail, off.trail, 6 * (size_t)(steps * nv) * sizeof(double)) == 0;
    printf("    %-6s %5.3f %-8s %8d %6d %8d %6d  %s\n", scene, stride, body_name[kind],
           on.accepted, on.failed, on.crossed, on.most, same ? "yes" : "no");
    CHECK(off.crossed == 0 && off.miscounted == 0);
    *miscounted += on.miscounted;
    *crossed += on.crossed;
    *differ += !same;
    tried_free(&on);
    tried_free(&off);
}

static void swept(void) {
    static const double stride[] = {0.15, 0.3, 0.45, 0.6};
    const int           steps = test_full() ? 30 : test_quick() ? 4 : 8;
    const int           every = test_full() ? 1 : test_quick() ? 4 : 2;
    int                 i, kind, crossed = 0, differ = 0, miscounted = 0;
    title();
    for (kind = 0; kind < BODIES; kind++)
        for (i = test_full() ? 0 : 1; i < 4; i += every)
            judge(sweep(kind, stride[i], 1, steps), sweep(kind, stride[i], 0, steps), "sweep",
                  stride[i], kind, 100, steps, &crossed, &differ, &miscounted);
    OPEN_MOST(crossed, 0, "accepted steps that end with crossings");
    OPEN_MOST(miscounted, 0, "steps whose crossings the kit counts otherwise");
    OPEN_MOST(differ, 0, "runs that the flag changes");
}

static void pressed(void) {
    const int steps = test_full() ? 40 : test_quick() ? 8 : 12;
    int       kind, crossed = 0, differ = 0, miscounted = 0;
    title();
    for (kind = 0; kind < BODIES; kind++)
        judge(press(kind, 1, steps), press(kind, 0, steps), "press", 0.015, kind, 100, steps,
              &crossed, &differ, &miscounted);
    OPEN_MOST(crossed, 0, "accepted steps that end with crossings");
    OPEN_MOST(miscounted, 0, "steps whose crossings the kit counts otherwise");
    OPEN_MOST(differ, 0, "runs that the flag changes");
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(swept);
    RUN(pressed);
    RUN(stage_rows_left);
    return TEST_END();
}
