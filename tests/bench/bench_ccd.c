/* bench_ccd.c - time per query of continuous detection by kind and answer, false alarms by
 * distance: the public queries with and without a separation, and pairs as a step of cloth has
 * them (edges of 1 cm, motions of 2 mm, separation 0.5 mm).
 *   cc -std=c99 -O3 -march=native -ffp-contract=off bench/bench_ccd.c -lm && ./a.out */
#define _XOPEN_SOURCE 600
#define CLOTHSIM_IMPLEMENTATION
#include "../../clothsim_collide.h"
#include "bench.h"
#include "../ccd.h"

enum { REPEATS = 7, PAIRS = 100000 };

/* CPU time per query of one kind and truth (-1: all), ns; the median of the repeats. */
static double measure(const ccd_query *q, int n, int ee, int truth, double relative, int *count,
                      int *hits) {
    double t[REPEATS], toi, sum = 0;
    int    i, repeat;
    for (repeat = 0; repeat < REPEATS; repeat++) {
        const double begin = bench_cpu();
        *count = *hits = 0;
        for (i = 0; i < n; i++) {
            if (q[i].ee != ee || (truth >= 0 && q[i].truth != truth)) continue;
            ++*count;
            /* toi holds the separation's unit here: the size of the pair */
            *hits += ccd_call(ee, q[i].x, relative > 0 ? relative * q[i].toi : 0, &toi);
            sum += toi;
        }
        t[repeat] = *count ? 1e9 * (bench_cpu() - begin) / *count : 0;
    }
    CHECK(sum >= 0);
    return bench_median(t, REPEATS);
}

static void public_queries(void) {
    static const double seps[] = {0, 1e-6, 1e-3};
    static const char  *kinds[] = {"vertex-face", "edge-edge"};
    ccd_chart           chart;
    int                 n, i, k, count, hits;
    double              toi;
    ccd_query          *q = ccd_load(&n);
    if (!q) SKIP("no ../shared/data/ccd");
    memset(&chart, 0, sizeof chart);
    for (i = 0; i < n; i++) {
        q[i].toi = ccd_size(q[i].x);
        if (!q[i].truth) ccd_chart_add(&chart, q + i, ccd_call(q[i].ee, q[i].x, 0, &toi));
    }
    ccd_chart_print(&chart);
    for (k = 0; k < 3; k++)
        for (i = 0; i < 4; i++) {
            const double ns = measure(q, n, i & 1, i >> 1, seps[k], &count, &hits);
            printf("  separation %5g of the size, %-11s, %s: %5d queries, %5d contacts, %6.0f ns\n",
                   seps[k], kinds[i & 1], i >> 1 ? "touching" : "apart   ", count, hits, ns);
        }
    free(q);
}

/* Random triangles and edges of up to 1 cm in layers up to 6 mm apart. */
static void cloth_pairs(void) {
    unsigned long long seed = 1;
    ccd_query         *q = (ccd_query *)bench_get(PAIRS, sizeof *q);
    int                i, j, hit, count, hits;
    for (i = 0; i < PAIRS; i++) {
        const double gap = ref_uniform(&seed, -6e-3, 6e-3);
        double       toi;
        q[i].ee = i & 1;
        for (j = 0; j < 12; j++) {
            const int first = j < (i & 1 ? 6 : 3);
            q[i].x[j] = j % 3 < 2 ? ref_uniform(&seed, 0, 0.012)
                                  : ref_uniform(&seed, 0, 1e-3) + (first ? gap : 0);
            q[i].x[12 + j] = q[i].x[j] + ref_uniform(&seed, -1e-3, 1e-3);
        }
        q[i].truth = ccd_call(q[i].ee, q[i].x, 5e-4, &toi);
        q[i].toi = 1;
    }
    for (i = 0; i < 2; i++)
        for (hit = 0; hit < 2; hit++) {
            const double ns = measure(q, PAIRS, i, hit, 5e-4, &count, &hits);
            printf("  cloth, 0.5 mm, %-11s, %s: %5d pairs, %6.0f ns\n",
                   i ? "edge-edge" : "vertex-face", hit ? "contact" : "none   ", count, ns);
            CHECK(hits == (hit ? count : 0));
        }
    free(q);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(public_queries);
    RUN(cloth_pairs);
    return TEST_END();
}
