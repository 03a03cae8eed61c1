/* bench_sleep.c - what a step costs on the move, at rest but awake, and asleep (desc.sleep).
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_sleep.c -lm && ./a.out
 * fold: a sheet of 0.5 m, 12 x 12, its edge led over and let go; heap: with three more that fall on
 * a ball, examples/13_fold.c; hang: 32 x 32 at two corners, started at rest after 1 s of swinging.
 * moving: mean of the first second; still: of the steps from where the rest began that put the
 * cloth to sleep; asleep: mean of 1000. mean: of 10 s from where the rest began. CPU time. */
#define _XOPEN_SOURCE 600
#include "../../clothsim_collide.h"
#include "bench.h"

enum { N = 12, FOLD = 1, HEAP = 4, SECOND = 60, LATEST = 900, SLEPT = 1000 };

static const double sleep_after = 0.25;

typedef struct scene {
    cloth_desc     desc;
    cloth_mesh    *one[HEAP], *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_pin      pins[N];
} scene;

/* examples/13_fold.c, its first `sheets` sheets. */
static void open_fold(scene *s, int sheets) {
    const double        origin[3] = {0, 0, 0}, center[3] = {0.9, 0, 0.25};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    int                 i, k;
    memset(s, 0, sizeof *s);
    for (k = 0; k < sheets; k++) {
        const double side = k > 0 ? 0.4 : 0.5, turn = 0.4 * k;
        CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, side, side, s->one + k));
        for (i = 0; i < N * N; i++) {
            double *p = s->one[k]->x + 3 * i, u = p[0] - 0.2, v = p[2] - 0.2;
            p[1] = k ? 0.09 + 0.04 * k : 0.002;
            if (k) p[0] = 0.9 + u * cos(turn) - v * sin(turn);
            if (k) p[2] = 0.25 + u * sin(turn) + v * cos(turn);
        }
    }
    CHECK(!cloth_mesh_merge(NULL, s->one, sheets, &s->mesh));
    s->desc = cloth_desc_default();
    for (i = 0; i < N; i++) s->pins[i].vertex = N * i + N - 1, s->pins[i].axes = CLOTH_AXIS_ALL;
    s->desc.nv = s->mesh->nv, s->desc.x_rest = s->mesh->x, s->desc.X = s->mesh->X;
    s->desc.nf = s->mesh->nf, s->desc.faces = s->mesh->faces, s->desc.part = s->mesh->part;
    s->desc.npins = N, s->desc.pins = s->pins;
    s->desc.material.bending = 1e-5;
    s->desc.contact = CLOTH_CONTACT_SELF;
    s->desc.sleep = sleep_after;
    CHECK(!cloth_model_create(&s->desc, &s->model) && !cloth_sim_create(s->model, &s->sim));
    CHECK(!cloth_collide_create(s->sim, NULL, &s->c));
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = origin, o.normal[1] = 1;
    CHECK(!cloth_collide_add(s->c, &o, &id));
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = center, o.radius = 0.1;
    CHECK(!cloth_collide_add(s->c, &o, &id));
}

/* The edge from the end (x = 0.5) over to x = 0.1 in a half circle, in the first second. */
static void lead(scene *s, double t) {
    const double a = fmin(t, 1), turn = 3.14159265 * a * a * (3 - 2 * a);
    const double p[2] = {0.27 + 0.23 * cos(turn), 0.002 + 0.012 * a + 0.2 * sin(turn)};
    int          i;
    for (i = 0; i < N && t <= 1.1; i++) {
        double x[3];
        x[0] = p[0], x[1] = p[1], x[2] = s->mesh->x[3 * s->pins[i].vertex + 2];
        if (t > 1.05) CHECK(!cloth_sim_unpin(s->sim, s->pins[i].vertex));
        else CHECK(!cloth_sim_pin(s->sim, s->pins[i].vertex, CLOTH_AXIS_ALL, x));
    }
}

/* Swings for a second, then is put where it hangs. */
static void open_hang(scene *s) {
    memset(s, 0, sizeof *s);
    s->desc = bench_desc(1e4, 3e-5, 1e-4);
    s->desc.sleep = sleep_after;
    s->desc.material.damping = 0.1;
    CHECK(!bench_sheet(&s->desc, 32, &s->model, &s->sim));
}

static void shut(scene *s) {
    int k;
    cloth_collide_destroy(s->c);
    bench_free(&s->model, &s->sim);
    cloth_mesh_destroy(NULL, s->mesh);
    for (k = 0; k < HEAP; k++) cloth_mesh_destroy(NULL, s->one[k]);
}

static void measure(FILE *csv, const char *name, int sheets) {
    double       ms[LATEST], at[LATEST], moving = 0, still = 0, asleep[2] = {0, 0}, mean, start;
    cloth_report r;
    scene        s;
    int          i, k, n = 0, steps = 0, window = (int)(sleep_after * 60 + 0.5);
    if (sheets) open_fold(&s, sheets);
    else open_hang(&s);
    for (i = 0; i < LATEST && !n; i++) {
        if (sheets) lead(&s, (i + 1) / 60.0);
        else if (i == SECOND) CHECK(!cloth_solve_static(s.sim, NULL));
        start = bench_cpu();
        CHECK(!cloth_step(s.sim, 1.0 / 60, &r));
        ms[i] = 1e3 * (bench_cpu() - start);
        at[i] = cloth_sim_state(s.sim)->x[0];
        if (r.outcome == CLOTH_STEP_ASLEEP) n = i;
    }
    CHECK(n > SECOND);
    for (i = 0; i < SECOND; i++) moving += ms[i] / SECOND;
    for (i = n - window; i < n; i++, steps++) still += ms[i] / window;
    for (k = 0; k < 2; k++) {
        start = bench_cpu();
        for (i = 0; i < SLEPT; i++) CHECK(!cloth_step(s.sim, 1.0 / 60, k ? &r : NULL));
        asleep[k] = 1e3 * (bench_cpu() - start) / SLEPT;
    }
    mean = (still * steps + asleep[0] * (600 - steps)) / 600;
    printf("  %-5s %7.2f %9.2f %9.4f %9.4f %10.2f %% %9.2f %% %8.2f %%   asleep at %.2f s\n", name,
           moving, still, asleep[0], asleep[1], 100 * asleep[0] / moving, 100 * asleep[1] / moving,
           100 * mean / moving, n / 60.0);
    fprintf(csv, "%s,%.4f,%.4f,%.5f,%.5f\n", name, moving, still, asleep[0], asleep[1]);
    CHECK(asleep[0] < 0.01 * moving);
    CHECK(fabs(at[n - 1] - at[n - window]) < 2e-5);     /* it stays: friction holds it */
    shut(&s);
}

static void asleep(void) {
    FILE *csv = bench_csv("sleep", "scene,moving ms,still ms,asleep ms,asleep with report ms");
    printf("  scene  moving     still    asleep  reported   asleep/mov.   reported   10 s mean\n");
    measure(csv, "hang", 0);
    measure(csv, "fold", FOLD);
    measure(csv, "heap", HEAP);
    fclose(csv);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(asleep);
    return TEST_END();
}
