/* bench_contact.c - what contact costs: its share of a step (bench_drape.c: against Bullet).
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -pthread -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_contact.c -lm && ./a.out
 * Drape: a sheet of 1 m, 0.2 kg, falls on a sphere of 0.3 m, 90 steps of 1/60 s, N x N vertices;
 * afterwards pairs of faces that intersect (exact.h), vertices inside the sphere, and stretch. All
 * times are CPU time, medians of steps.
 * Walk: the skirt and the T-shirt of ../shared/data on their walking body, 30 steps.
 * The share is all that contact does (cloth_report.ms.contact), its energy and its cuts of moves
 * included: 0.58 to 0.68 of a drape, 0.82 of the skirt, 0.77 of the T-shirt. Without those, as it
 * was counted once, 0.07 to 0.17.
 * Workers: the time by the clock that contact takes of the T-shirt's first steps, one and two
 * workers in turns. 1.64 times as fast; 1.4 when one thread chose contacts among the pairs, 1.47
 * when it cut lists, found least times and what blocks.
 *
 * What was tried for the proximity potential ([8.2] of clothsim_collide.h) and lost: a sum over all
 * pairs (forces grow with the mesh); levels of stiffness instead of a pole (a pressed pair climbed
 * 10^12); a pole of the first order (pairs 1e-9 m above it, at 10^8 N/m, took three times the
 * iterations), of the third (no better); N from the step before (a step without friction); a secant
 * by what the matrix's diagonal has behind a contact (a thousand times too stiff where layers move
 * together); one stiffness for all ranges (forces of slivers of a mesh, newtons, came 1e-7 m above
 * the pole, at 10^12 N/m); secants for what is not yet the nearest of its group (ten times CG's
 * iterations); frames of friction that wait for N (a strip around a cylinder flew off). Solved
 * again at once with a secant's stiffness, twice at most, a curtain hit by a ball took 1.2 times
 * the iterations, a twisted tube 2.2 times CG's; a sheet on a ball that spins 0.9 of the
 * iterations.
 * Of impact zones [8.4]: ten sheets that fall on each other have 120 000 rows, and their slowest
 * step is 2.5 times cheaper where minimising begins on the straight way from two rows a vertex on;
 * a sheet that has come to rest on a ball takes 0.8 of the time for a step that keeps the list of
 * its guess. Without holds of what is in a pinch between vertices 5 of 300 steps of garments that
 * begin with 88 to 1 248 pairs fail and 16 are halved, with them none. */
#define _XOPEN_SOURCE 600
#include "../../clothsim_collide.h"
#include "../../examples/parallel_pthreads.h"
#include "../../examples/shapes.h"
#include "bench.h"
#include "../exact.h"
#include "../body.h"

enum { STEPS = 90, WALK = 30, TURN = 14, TURNS = 3 };

#define DRAPE_COLUMNS "scene,n,median ms,mean ms,contact's share,pairs,inside,stretch,most"

static const double drape_center[3] = {0.5, -0.4, 0.5};
static const double drape_radius = 0.3;

typedef struct drape {
    double median, mean, share;             /* ms a step; contact of all                       */
} drape;

/* Positions at the end into x [n n x 3]. */
static drape drape_ours(int n, double *x, int **faces, int *nf) {
    cloth_desc          d = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_mesh         *sheet = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *c = NULL;
    double              ms[STEPS], total = 0, contact = 0;
    drape               out;
    int                 i;
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, 1.0, 1.0, &sheet));
    d.hooks.clock.fn = bench_stage;
    d.nv = sheet->nv, d.x_rest = sheet->x;
    d.nf = sheet->nf, d.faces = sheet->faces;
    d.material.density = 0.2;
    d.contact = CLOTH_CONTACT_SELF;
    CHECK(!cloth_model_create(&d, &model) && !cloth_sim_create(model, &sim));
    CHECK(!cloth_collide_create(sim, NULL, &c));
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = drape_center, ball.radius = drape_radius;
    CHECK(!cloth_collide_add(c, &ball, &id));
    for (i = 0; i < STEPS; i++) {
        cloth_report         r;
        const double         start = bench_cpu();
        CHECK(!cloth_step(sim, 1.0 / 60, &r));
        ms[i] = 1e3 * (bench_cpu() - start);
        total += ms[i];
        contact += r.ms.contact;
    }
    memcpy(x, cloth_sim_state(sim)->x, 3 * (size_t)sheet->nv * sizeof *x);
    *nf = sheet->nf;
    *faces = (int *)bench_get(3 * (size_t)sheet->nf, sizeof(int));
    memcpy(*faces, sheet->faces, 3 * (size_t)sheet->nf * sizeof(int));
    out.mean = total / STEPS, out.share = contact / total, out.median = bench_median(ms, STEPS);
    cloth_collide_destroy(c);
    bench_free(&model, &sim);
    cloth_mesh_destroy(NULL, sheet);
    return out;
}

/* Pairs that intersect, vertices inside the sphere, ratio of area to that at rest. */
static void drape_judge(FILE *csv, const char *name, int n, const double *x, const int *faces,
                        int nf, const drape *t) {
    double area = 0, longest = 0;
    int    i, k, inside = 0, pairs = exact_intersections(n * n, x, nf, faces, NULL, 0);
    for (i = 0; i < n * n; i++) {
        double r2 = 0;
        for (k = 0; k < 3; k++) r2 += pow(x[3 * i + k] - drape_center[k], 2);
        inside += r2 < drape_radius * drape_radius;
    }
    for (i = 0; i < n * n; i++) {           /* along the two directions of the net */
        double a, b;
        if (i % n == n - 1 || i / n == n - 1) continue;
        a = bench_distance(x + 3 * i, x + 3 * (i + 1), 1, NULL) * (n - 1);
        b = bench_distance(x + 3 * i, x + 3 * (i + n), 1, NULL) * (n - 1);
        longest = fmax(longest, fmax(a, b));
        area += (a + b) / 2;
    }
    area /= (n - 1) * (n - 1);
    printf("  drape %d x %d, %-7s %6.1f ms a step (median), %6.1f (mean); pairs that intersect %d, "
           "vertices inside %d; stretch mean %+.2f %%, most %+.2f %%\n", n, n, name, t->median,
           t->mean, pairs, inside, 100 * (area - 1), 100 * (longest - 1));
    fprintf(csv, "drape %s,%d,%g,%g,%g,%d,%d,%g,%g\n", name, n, t->median, t->mean, t->share, pairs,
            inside, area - 1, longest - 1);
    if (name[0] == 'c') CHECK(pairs == 0 && inside == 0);
}

static double wall(void *user) {
    (void)user;
    return bench_wall();
}

/* The walk of a garment, two frames of motion a step of 1/60 s: ms of each step and of contact in
 * it, by CPU time, or by the clock with so many workers. 0: no data. */
static int walk(const char *name, int workers, int steps, double *ms, double *contact) {
    cloth_desc          d = cloth_desc_default();
    cloth_collide_desc  k = cloth_collide_desc_default();
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    parallel_pool      *pool = workers > 1 ? parallel_pool_create(workers) : NULL;
    cloth_obstacle      id;
    cloth_mesh         *mesh = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *c = NULL;
    double             *x;
    char                path[256];
    body                b;
    int                 i;
    snprintf(path, sizeof path, "data/garments/%s.obj", name);
    if (!body_load(&b) || cloth_obj_load(NULL, test_shared(path), NULL, &mesh)) {
        printf("  walk skipped: the shared data is not there\n");
        return 0;
    }
    x = (double *)bench_get(3 * (size_t)b.mesh->nv, sizeof *x);
    body_pose(&b, 0, x);
    d.hooks.clock.fn = workers ? wall : bench_stage;
    if (pool) d.hooks.parallel = parallel_pool_hook(pool);
    d.nv = mesh->nv, d.x_rest = mesh->x;
    d.nf = mesh->nf, d.faces = mesh->faces;
    d.material = cloth_material_fabric(CLOTH_FABRIC_COTTON_KNIT);
    d.contact = CLOTH_CONTACT_SELF;
    k.thickness = 2e-3;
    k.initial = CLOTH_INITIAL_EXEMPT;
    CHECK(!cloth_model_create(&d, &model) && !cloth_sim_create(model, &sim));
    CHECK(!cloth_collide_create(sim, &k, &c));
    o.nv = b.mesh->nv, o.nf = b.mesh->nf, o.x = x, o.faces = b.mesh->faces;
    o.self_penetrating = 1;
    CHECK(!cloth_collide_add(c, &o, &id));
    for (i = 0; i < steps; i++) {
        cloth_report r;
        body_pose(&b, 2 * i + 2, x);
        CHECK(!cloth_collide_move(c, id, x));
        CHECK(!cloth_collide_step(c, 1.0 / 60, 4, &r));
        ms[i] = r.ms.total;
        contact[i] = r.ms.contact;
    }
    cloth_collide_destroy(c);
    bench_free(&model, &sim);
    cloth_mesh_destroy(NULL, mesh);
    parallel_pool_destroy(pool);
    free(x);
    body_free(&b);
    return 1;
}

static void walk_share(FILE *csv, const char *name) {
    double ms[WALK], share[WALK];
    int    i;
    if (!walk(name, 0, WALK, ms, share)) return;
    for (i = 0; i < WALK; i++) {
        share[i] /= ms[i];
        fprintf(csv, "walk %s,%d,%g,%g,%g,,,,\n", name, i, ms[i], ms[i], share[i]);
    }
    printf("  walk, %s: %.1f ms a step, contact's share %.2f (medians of %d)\n", name,
           bench_median(ms, WALK), bench_median(share, WALK), WALK);
    OPEN_MOST(bench_median(share, WALK), 0.5, "contact's share of a walk");
}

static void shares(void) {
    static const int sizes[] = {16, 32, 64};
    FILE *csv = bench_csv("contact_share", DRAPE_COLUMNS);
    int   i;
    for (i = 0; i < 3; i++) {
        const int n = sizes[i];
        double   *x = (double *)bench_get(3 * (size_t)(n * n), sizeof *x);
        int      *faces, nf;
        drape     t = drape_ours(n, x, &faces, &nf);
        drape_judge(csv, "clothsim", n, x, faces, nf, &t);
        printf("  contact's share of that: %.2f\n", t.share);
        OPEN_MOST(t.share, 0.5, "contact's share of a drape");
        free(faces);
        free(x);
    }
    walk_share(csv, "skirt_f_clean");
    walk_share(csv, "tshirt_f_clean");
    fclose(csv);
}

static void workers(void) {
    double ms[TURN], contact[TURN], sum[2][TURNS] = {{0}, {0}}, one, two;
    int    turn, i;
    for (turn = 0; turn < 2 * TURNS; turn++) {
        if (!walk("tshirt_f_clean", turn % 2 + 1, TURN, ms, contact)) return;
        for (i = 0; i < TURN; i++) sum[turn % 2][turn / 2] += contact[i];
    }
    one = bench_median(sum[0], TURNS), two = bench_median(sum[1], TURNS);
    printf("  contact in %d steps of a T-shirt's walk: one worker %.0f ms, two %.0f: %.2f times\n",
           TURN, one, two, one / two);
    OPEN_MOST(two / one, 1 / 1.5, "contact on two workers, of one's time");
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(shares);
    RUN(workers);
    return TEST_END();
}
