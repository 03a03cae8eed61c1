/* bench_qp.c - time of cloth_qp_solve against the number of rows, 1 to 5000: two sheets pressed
 * together, vertices of one against faces of the other; once, and four times each with normals that
 * differ by 0.1, 1e-3 and 1e-6, as successive passes see a contact; and squeezed without room.
 * CPU time, work kept; the median of 100 contact rows must stay under 1 ms. With 32 digits
 * throughout the dual active set, factored from its first row, took 4.3 s for 0.8 of a T-shirt's 61
 * programs of 200 to 1600 rows.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. \
 *      bench/bench_qp.c -o bench_qp -lm && ./bench_qp
 * language: C only */
#define _XOPEN_SOURCE 600
#include "../../clothsim_collide.h"
#include "bench.h"
#include "../qp_data.h"

static uint64_t seed = 1;

static double rnd(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) / 4503599627370496.0 - 1.0;
}

/* Row i: contact i % base; its weights are those of the contact, its normal is turned by `turn`. */
static void contact(qp_problem *p, int i, int base, int side, double turn) {
    const int      b = i % base, up = b % 2, off = side * side;
    const int      at = b / 2 / (side - 1) % (side - 1) * side + b / 2 % (side - 1);
    const uint64_t keep = seed;
    double         w[4], n[3];
    int            v[4], c, k;
    v[0] = up ? at : off + at + side + 1;
    v[1] = up ? off + at : at + 1;
    v[2] = up ? off + at + 1 : at + side;
    v[3] = up ? off + at + side : at + side + 1;
    seed = (uint64_t)b * 7919 + 12345;
    for (k = 0; k < 9; k++) rnd();
    w[0] = 1;
    w[1] = -0.1 - 0.4 * fabs(rnd());
    w[2] = -0.1 - 0.4 * fabs(rnd());
    w[3] = -1 - w[1] - w[2];
    seed = keep;
    n[0] = turn * rnd();
    n[1] = turn * rnd();
    n[2] = up ? 1 : -1;
    for (c = 0; c < 4; c++)
        for (k = 0; k < 3; k++) {
            p->col[12 * i + 3 * c + k] = 3 * v[c] + k;
            p->val[12 * i + 3 * c + k] = w[c] * n[k];
        }
    p->row[i + 1] = 12 * (i + 1);
    p->h[i] = -5e-5;
}

static qp_problem sheets(int m, int copies, double turn, int no_room) {
    const int  base = (m + copies - 1) / copies;
    qp_problem p;
    int        side = 2, i, k;
    while ((side - 1) * (side - 1) * 2 < base) side++;
    qp_make(&p, 6 * side * side, m, 12 * m);
    for (i = 0; i < 2 * side * side; i++) {
        for (k = 0; k < 3; k++) p.minv[3 * i + k] = 1;
        p.x0[3 * i] = 0.01 * (i % side);
        p.x0[3 * i + 1] = 0.01 * (i / side % side);
        p.x0[3 * i + 2] = 1e-4 * rnd();
    }
    for (i = 0; i < m; i++) contact(&p, i, base, side, turn);
    if (no_room)                            /* the last row contradicts the first */
        for (k = 0, p.h[m - 1] = 4e-5; k < 12; k++) {
            p.col[12 * (m - 1) + k] = p.col[k];
            p.val[12 * (m - 1) + k] = -p.val[k];
        }
    return p;
}

typedef struct measured {
    double          median;
    cloth_qp_report r;
    double          worst;
} measured;

static measured measure(const qp_problem *p, cloth_qp_work *work) {
    static double    t[200];
    const int        repeats = p->qp.m <= 200 ? 100 : p->qp.m <= 1000 ? 11 : 3;
    double          *x = (double *)qp_get((size_t)p->qp.n, sizeof *x);
    double          *lambda = (double *)qp_get((size_t)p->qp.m, sizeof *lambda);
    cloth_qp_options o = cloth_qp_options_default();
    measured         d;
    int              k;
    o.work = work;
    for (k = 0; k < repeats; k++) {
        t[k] = bench_cpu();
        CHECK(cloth_qp_solve(&p->qp, &o, x, lambda, &d.r) == CLOTH_OK);
        t[k] = bench_cpu() - t[k];
    }
    d.median = bench_median(t, repeats);
    d.worst = d.r.outcome == CLOTH_QP_SOLVED ? qp_check(&p->qp, x, lambda).worst : 0;
    if (d.r.outcome == CLOTH_QP_INFEASIBLE) CHECK(qp_is_farkas(&p->qp, lambda));
    free(x);
    free(lambda);
    return d;
}

static void rows(void) {
    static const int    sizes[] = {1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 3000, 5000};
    static const double turns[] = {0.1, 0.1, 1e-3, 1e-6, 0.1};
    static const char  *names[] = {"once", "4 x, 0.1", "4 x, 1e-3", "4 x, 1e-6", "no room"};
    FILE               *csv = bench_csv("qp", "kind,rows,unknowns,us,iterations,active,precise");
    cloth_qp_work      *work = NULL;
    int                 kind, i;
    CHECK(cloth_qp_work_create(NULL, &work) == CLOTH_OK);
    printf("  %-10s %5s %6s %10s %5s %6s %7s %8s\n", "kind", "rows", "n", "us", "sets", "active",
           "precise", "residual");
    for (kind = 0; kind < 5; kind++)
        for (i = kind == 4; i < (int)(sizeof sizes / sizeof *sizes); i++) {
            qp_problem p = sheets(sizes[i], kind && kind < 4 ? 4 : 1, turns[kind], kind == 4);
            measured   d = measure(&p, work);
            CHECK(d.r.outcome == (kind == 4 ? CLOTH_QP_INFEASIBLE : CLOTH_QP_SOLVED));
            CHECK(d.worst <= 1e-9);
            if (sizes[i] == 100) CHECK(d.median < 1e-3);
            printf("  %-10s %5d %6d %10.1f %5d %6d %7d %8.1e\n", names[kind], sizes[i], p.qp.n,
                   1e6 * d.median, d.r.iterations, d.r.active, d.r.precise, d.worst);
            fprintf(csv, "%s,%d,%d,%.2f,%d,%d,%d\n", names[kind], sizes[i], p.qp.n,
                    1e6 * d.median, d.r.iterations, d.r.active, d.r.precise);
            qp_free(&p);
        }
    printf("  work holds %.1f MB\n", 1e-6 * (double)cloth_qp_work_bytes(work));
    cloth_qp_work_destroy(work);
    fclose(csv);
}

/* The impact zones of the shared data. */
static void real_zones(void) {
    const char    *path = test_shared("data/qp/contact.qp");
    FILE          *f = *path ? fopen(path, "r") : NULL;
    cloth_qp_work *work = NULL;
    qp_problem     p;
    if (!f) SKIP("no ../shared/data/qp");
    CHECK(cloth_qp_work_create(NULL, &work) == CLOTH_OK);
    while (qp_read(f, &p)) {
        measured d = measure(&p, work);
        CHECK(d.r.outcome == CLOTH_QP_SOLVED && d.worst <= 1e-9);
        printf("  %-32s %5d %6d %10.1f %5d %6d %7d %8.1e\n", p.name, p.qp.m, p.qp.n,
               1e6 * d.median, d.r.iterations, d.r.active, d.r.precise, d.worst);
        qp_free(&p);
    }
    cloth_qp_work_destroy(work);
    fclose(f);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(rows);
    RUN(real_zones);
    return TEST_END();
}
