/* bench_growth.c - CPU time of an implicit frame and bytes a vertex from 1000 to 60 000 vertices,
 * with CG alone and with the sparse Cholesky.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_growth.c -lm && ./a.out
 * BENCH_SECONDS=n (default 300): a size that would take longer than that, and all above it, are
 * left out of a method's fit, and the table says so.
 *
 * Hanging sheet, Y = 1e4 N/m, D = 3e-5 N m, h = 1/60 s, tolerance 1e-4 m, frames 3 to 8 of the
 * fall from the horizontal start. The exponent is the slope of log CPU over log vertices. */
#define _XOPEN_SOURCE 600
#include "bench.h"

enum { SIZES = 7, FIRST = 2, LAST = 8, METHODS = 2 };

static const int          SIDES[SIZES] = {32, 45, 64, 90, 128, 181, 245};
static const cloth_linear METHOD[METHODS] = {CLOTH_LINEAR_SGS, CLOTH_LINEAR_CHOLESKY};
static const char *const  NAME[METHODS] = {"CG with Gauss-Seidel (AUTO too)", "Cholesky"};

typedef struct point {
    double       cpu, linear;               /* s a frame                                       */
    double       newton, cg, factors;       /* a frame                                         */
    long long    allocations;               /* after the first step                            */
    cloth_bytes  bytes;
    cloth_status status;
} point;

static point measure(int side, cloth_linear linear) {
    cloth_desc   d = bench_desc(1e4, 3e-5, 1e-4);
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_report report;
    point        p;
    int          i;
    memset(&p, 0, sizeof p);
    d.linear = linear;
    d.hooks.clock.fn = bench_stage;
    p.status = bench_sheet(&d, side, &model, &sim);
    for (i = 0; i < LAST && !p.status; i++) {
        const double t0 = bench_cpu();
        p.status = cloth_step(sim, 1.0 / 60, &report);
        if (i > 0) p.allocations += report.counts.allocations;
        if (i < FIRST) continue;
        p.cpu += (bench_cpu() - t0) / (LAST - FIRST);
        p.linear += 1e-3 * report.ms.linear / (LAST - FIRST);
        p.newton += (double)report.newton / (LAST - FIRST);
        p.cg += (double)report.cg / (LAST - FIRST);
        p.factors += (double)report.factorizations / (LAST - FIRST);
    }
    p.bytes = report.bytes;
    bench_free(&model, &sim);
    return p;
}

/* The exponent over the sizes that were run, 0 when the method is not there. */
static double method(FILE *csv, int which, double limit) {
    double n[SIZES], t[SIZES], slope;
    int    i, k = 0;
    printf("  %s\n    %8s %11s %8s %8s %9s %8s %9s  bytes a vertex (matrix, factor)\n", NAME[which],
           "vertices", "CPU ms", "linear", "Newton", "CG", "factors", "exponent");
    for (i = 0; i < SIZES; i++) {
        const double nv = (double)SIDES[i] * SIDES[i];
        const double expected = k ? t[k - 1] * pow(nv / n[k - 1], 1.6) * LAST : 0;
        point        p;
        if (expected > limit) {
            printf("    skipped: %.0f vertices and more would take over %.0f s\n", nv, limit);
            break;
        }
        p = measure(SIDES[i], METHOD[which]);
        if (p.status == CLOTH_ERR_UNSUPPORTED) {
            printf("    skipped: not built in\n");
            return 0;
        }
        CHECK(p.status == CLOTH_OK);
        CHECK(p.allocations == 0);
        if (p.status) {
            printf("    %8.0f %s\n", nv, cloth_status_text(p.status));
            continue;
        }
        n[k] = nv, t[k++] = p.cpu;
        printf("    %8.0f %11.2f %8.2f %8.2f %9.1f %8.1f", nv, 1e3 * p.cpu,
               1e3 * p.linear, p.newton, p.cg, p.factors);
        if (k > 1) printf(" %9.2f", log(t[k - 1] / t[k - 2]) / log(n[k - 1] / n[k - 2]));
        else printf("         -");
        printf("  %.0f (%.0f, %.0f)\n", (double)p.bytes.total / nv, (double)p.bytes.matrix / nv,
               (double)p.bytes.factor / nv);
        fflush(stdout);
        fprintf(csv, "%s,%.0f,%.4f,%.3f,%.1f,%.1f,%.0f,%.0f\n", NAME[which], nv, 1e3 * p.cpu,
                p.newton, p.cg, p.factors, (double)p.bytes.total / nv,
                (double)p.bytes.factor / nv);
        fflush(csv);
    }
    slope = bench_exponent(n, t, k);
    printf("    exponent %.2f over %d sizes\n", slope, k);
    return slope;
}

static void growth(void) {
    const char  *text = getenv("BENCH_SECONDS");
    const double limit = text ? atof(text) : 300;
    FILE  *csv = bench_csv("growth", "method,vertices,cpu_ms,newton,cg,factors,bytes,factor_bytes");
    double best = HUGE_VAL, slope[METHODS];
    int    i;
    for (i = 0; i < METHODS; i++) {
        slope[i] = method(csv, i, limit);
        if (slope[i] > 0 && slope[i] < best) best = slope[i];
    }
    printf("  ratio exponent of CG alone: %.2f (expect 1.5 to 1.6)\n", slope[0]);
    if (slope[1] > 0) printf("  ratio exponent of Cholesky: %.2f\n", slope[1]);
    printf("  ratio exponent, the best: %.2f (aim at most 1.4)\n", best);
    fclose(csv);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(growth);
    return TEST_END();
}
