/* heaps.c - many layers: the work of the slowest step against that of the median; cloth at rest.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. stability/heaps.c -lm
 * tier: default
 *
 *   sheets   ten sheets of 0.4 m, each turned a little, fall on a plane and on each other
 *   mat      two sides of a sheet (FULL=1: 60 x 60 vertices) are led to and fro over its middle
 *            and let go
 *   fold     a sheet that is folded over comes to rest: it stays, and its steps cost little
 *   heap     three sheets come to rest over a ball: they stay, and a step is a few iterations
 *
 * Times depend on the machine and are only printed. What is asked is counted: Newton and CG
 * iterations of the slowest step at most 10 times the median's, once things touch, and rows of the
 * largest zone, one for each time that a pair was hit, at most 4 a vertex. Calls of contact and ms
 * are printed beside them. No step may fail, no pair may cross at the end (exact.h). */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "../shapes.h"
#include "../exact.h"
#include "../stage.h"

#define STEPS 600

typedef struct toil {                       /* of each step                                    */
    int    n, failed, capped;               /* capped: steps at the cap of Newton's            */
    double newton[STEPS], cg[STEPS], calls[STEPS], rows[STEPS], ms[STEPS];
} toil;

static toil work;

/* One step of 1/60 s, in halves where it fails, its work added up. */
static int step(stage *s, double h, int depth) {
    cloth_report       r;
    const cloth_status status = cloth_step(s->sim, h, &r);
    work.newton[work.n] += r.newton;
    work.capped += r.outcome == CLOTH_STEP_MAX_ITERATIONS;
    work.cg[work.n] += r.cg;
    work.calls[work.n] += (double)r.counts.contact_calls;
    work.rows[work.n] = fmax(work.rows[work.n], cloth_collide_last(s->c).rows);
    work.ms[work.n] += r.ms.total;
    stage_count(s, &r);
    if (status == CLOTH_OK) return 1;
    if (depth == 3) return 0;
    return step(s, h / 2, depth + 1) && step(s, h / 2, depth + 1);
}

static void run(stage *s, int steps) {
    int i;
    for (i = 0; i < steps && work.n < STEPS; i++) {
        work.failed += !step(s, 1.0 / 60, 0);
        work.n++;
    }
}

static int order(const void *a, const void *b) {
    const double p = *(const double *)a, q = *(const double *)b;
    return (p > q) - (p < q);
}

/* Largest over median of the numbers from `first` on; prints both. *largest may be NULL. */
static double spread(const char *what, const double *list, int first, double *largest) {
    static double sorted[STEPS];
    const int     n = work.n - first;
    double        median, most;
    memcpy(sorted, list + first, (size_t)n * sizeof(double));
    qsort(sorted, (size_t)n, sizeof(double), order);
    median = sorted[n / 2], most = sorted[n - 1];
    printf("    %-18s median %10.1f  most %10.1f\n", what, median, most);
    if (largest) *largest = most;
    return most / fmax(median, 1);
}

static void judge(stage *s, int first) {
    double newton, cg, rows;
    int    crossed;
    newton = spread("Newton iterations", work.newton, first, NULL);
    cg = spread("CG iterations", work.cg, first, NULL);
    (void)spread("contact calls", work.calls, first, NULL);
    (void)spread("rows of a zone", work.rows, first, &rows);
    (void)spread("ms", work.ms, first, NULL);
    (void)stage_examine(s);
    crossed = s->npair;
    CHECK(crossed == 0);
    OPEN_MOST(work.failed, 0, "failed steps");
    OPEN_MOST(newton, 10, "Newton iterations, slowest step over median");
    OPEN_MOST(cg, 10, "CG iterations, slowest step over median");
    /* one row a pair: a vertex between two layers has a pair or two of its own, edges as many */
    OPEN_MOST(rows, 4 * s->mesh->nv, "rows of a zone");
}

static void sheets(void) {
    const int   n = test_full() ? 20 : 7, layers = 10;
    stage       s;
    memset(&work, 0, sizeof work);
    stage_layers(&s, layers, n, 0.01);
    s.desc.hooks.log.fn = NULL;
    if (stage_start(&s)) {
        stage_plane(&s, 0, 0.3);
        run(&s, test_full() ? 150 : 30);
        judge(&s, 5);
    }
    stage_end(&s);
}

/* Both sides go inwards on arcs, back and inwards again, higher each time; then let go. */
static void mat(void) {
    const int n = test_full() ? 60 : 14, steps = test_full() ? 150 : 45, lead = 2 * steps / 3;
    stage     s;
    int       i, j, side;
    memset(&work, 0, sizeof work);
    stage_sheet(&s, n, 1);
    s.desc.hooks.log.fn = NULL;
    for (i = 0; i < s.mesh->nv; i++) s.mesh->x[3 * i + 1] = 0.0015;
    if (stage_start(&s)) {
        stage_plane(&s, 0, 0.5);
        for (i = 0; i < steps; i++) {
            const double a = 3.0 * 3.14159265358979 * (i + 1) / lead, r = 0.2 - 0.0105 * a;
            for (j = 0; j < n; j++)
                for (side = 0; side < 2; side++) {
                    const int v = j * n + side * (n - 1);
                    double    to[3];
                    if (i >= lead) {
                        (void)cloth_sim_unpin(s.sim, v);
                        continue;
                    }
                    to[0] = 0.2 - r * cos(a) + 0.01 * a;
                    to[0] = side ? 1 - to[0] : to[0];
                    to[1] = 0.0015 + r * fabs(sin(0.5 * a)) + 0.005 * a;
                    to[2] = s.mesh->x[3 * v + 2];
                    (void)cloth_sim_pin(s.sim, v, CLOTH_AXIS_ALL, to);
                }
            run(&s, 1);
        }
        judge(&s, 5);
    }
    stage_end(&s);
}

/* Folded over along a line, half a turn of 2 cm radius between the layers, on a plane: it settles
 * for 8 s and is watched for a third of one. */
static void fold(void) {
    const int n = test_full() ? 32 : 12, settle = test_full() ? 480 : 60, watch = 20;
    stage     s;
    double   *x, *before, early = 0, late = 0, moved = 0;
    int       i, k;
    memset(&work, 0, sizeof work);
    stage_sheet(&s, n, 0.4);
    s.desc.hooks.log.fn = NULL;
    s.desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    x = (double *)malloc(6 * (size_t)s.mesh->nv * sizeof(double));
    if (!x) exit(2);
    before = x + 3 * s.mesh->nv;
    for (i = 0; i < s.mesh->nv; i++) {      /* half a turn of radius r about x = 0.2 */
        const double r = 0.02, u = s.mesh->x[3 * i] - 0.2, bend = 3.14159265358979 * r;
        double      *p = x + 3 * i;
        p[2] = s.mesh->x[3 * i + 2];
        if (u < -bend / 2) p[0] = u + bend / 2, p[1] = 0;
        else if (u > bend / 2) p[0] = bend / 2 - u, p[1] = 2 * r;
        else p[0] = r * cos(u / r), p[1] = r * (1 + sin(u / r));
        p[1] += 0.003;
    }
    s.desc.x = x;
    if (stage_start(&s)) {
        stage_plane(&s, 0, 0.5);
        run(&s, settle);
        for (i = 0; i < 30 && i < settle; i++) early = fmax(early, work.newton[i]);
        memcpy(before, s.state->x, 3 * (size_t)s.mesh->nv * sizeof(double));
        run(&s, watch);
        for (i = settle; i < work.n; i++) late += work.newton[i] / watch;
        for (i = 0; i < 3 * s.mesh->nv; i++) moved = fmax(moved, fabs(s.state->x[i] - before[i]));
        for (k = 0, i = settle; i < work.n; i++) k += work.newton[i] == 0;
        (void)spread("Newton iterations", work.newton, settle, NULL);
        (void)spread("ms, moving", work.ms, 0, NULL);
        (void)spread("ms, at rest", work.ms, settle, NULL);
        printf("    moved %.1e m in %d steps; without an iteration: %d of them\n", moved, watch, k);
        (void)stage_examine(&s);
        CHECK(s.npair == 0);
        CHECK(work.failed == 0);
        OPEN_MOST(moved, 1e-4, "motion at rest in a third of a second, m");
        if (test_full()) OPEN_MOST(late, 0.05 * early, "Newton iterations of a step at rest");
    }
    free(x);
    stage_end(&s);
}

/* Newton's updates are far below the tolerance there, and its line search halves some of them for
 * kinks of friction and of gaps: a step that asks for whole updates never ends. */
static void heap(void) {
    const int settle = 120, watch = 30;
    double   *before, late = 0, moved = 0;
    stage     s;
    int       i;
    memset(&work, 0, sizeof work);
    stage_layers(&s, 3, 12, 0);
    s.desc.hooks.log.fn = NULL;
    before = (double *)malloc(3 * (size_t)s.mesh->nv * sizeof(double));
    if (!before) exit(2);
    if (stage_start(&s)) {
        stage_plane(&s, -0.1, 0.3);
        stage_sphere(&s, 0.02, -0.1, 0, 0.1);
        run(&s, settle);
        memcpy(before, s.state->x, 3 * (size_t)s.mesh->nv * sizeof(double));
        work.capped = 0;
        run(&s, watch);
        for (i = settle; i < work.n; i++) late += work.newton[i] / watch;
        for (i = 0; i < 3 * s.mesh->nv; i++) moved = fmax(moved, fabs(s.state->x[i] - before[i]));
        (void)spread("Newton iterations", work.newton, settle, NULL);
        (void)spread("ms, moving", work.ms, 0, NULL);
        (void)spread("ms, at rest", work.ms, settle, NULL);
        printf("    moved %.1e m in %d steps, %d at the cap\n", moved, watch, work.capped);
        (void)stage_examine(&s);
        CHECK(s.npair == 0 && work.failed == 0 && work.capped == 0);
        CHECK(late <= 4);
        CHECK(moved <= 5 * s.desc.tolerance);
    }
    free(before);
    stage_end(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(sheets);
    RUN(mat);
    RUN(fold);
    RUN(heap);
    RUN(stage_rows_left);
    return TEST_END();
}
