/* fuzz_qp.c - random bytes as a QP, absurd numbers included.
 *   clang -g -O1 -fsanitize=fuzzer,address,undefined -I.. fuzz_qp.c -o fuzz_qp -lm
 *   ./fuzz_qp -max_total_time=600 -max_len=2048 corpus/
 * Without libFuzzer, files are replayed, or random bytes tried for N seconds:
 *   cc -std=c99 -g -O1 -fsanitize=address,undefined -DFUZZ_MAIN -I.. fuzz_qp.c -o fuzz_qp -lm
 *   ./fuzz_qp file ...        ./fuzz_qp -N
 * Aborts when a promise is broken: a sentence for every failure but for that of memory on purpose,
 * outputs untouched then, finite else; the residual of a solution, the certificate of a
 * contradiction; the same bits twice, with work or without; nothing left allocated. */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "fuzz.h"
#include "qp_data.h"

/* Mostly small numbers, some with any bits. */
static double number(bytes *b) {
    static const double absurd[] = {0, -0.0, 1e300, -1e300, 1e-300, 5e-324, 1e154, 1e-154};
    const unsigned      a = next(b);
    uint64_t            bits = 0;
    double              d;
    int                 k;
    if (a < 160) return ((int)a - 80) / 16.0;
    if (a < 200) return ((int)a - 180) * (1 + 1e-13 * next(b));
    if (a < 230) return ldexp((int)next(b) - 128, (int)a - 215);
    if (a < 250) return (int)next(b) - 128 + next(b) / 256.0;
    if (a < 253) return absurd[next(b) % 8];
    for (k = 0; k < 8; k++) bits = bits << 8 | next(b);
    memcpy(&d, &bits, sizeof d);
    return d;
}

static qp_problem make(bytes *b) {
    const int  n = 1 + (int)(next(b) % 12u), m = (int)(next(b) % 24u);
    qp_problem p;
    int        i, k, at = 0;
    qp_make(&p, n, m, 8 * m);
    for (i = 0; i < n; i++) {
        p.minv[i] = fabs(number(b));
        p.x0[i] = number(b);
    }
    for (i = 0; i < m; i++) {
        const unsigned kind = next(b);
        const int      from = i ? (int)(kind / 8u) % i : -1, count = (int)(kind % 8u);
        if (from >= 0 && kind % 8u == 7u) {                 /* a copy, or nearly */
            const double s = number(b), e = number(b) * 1e-12;
            for (k = p.row[from]; k < p.row[from + 1]; k++) {
                p.col[at] = p.col[k];
                p.val[at++] = s * p.val[k] + (k == p.row[from] ? e : 0);
            }
            p.h[i] = s * p.h[from];
        } else {
            for (k = 0; k < count; k++) {
                p.col[at] = (int)(next(b) % (unsigned)(n + (kind == 0xa5u)));
                p.val[at++] = number(b);
            }
            p.h[i] = number(b);
        }
        p.row[i + 1] = at;
    }
    return p;
}

static void all_finite(const double *a, int n) {
    int i;
    for (i = 0; i < n; i++) require(clothi_finite(a[i]));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    host             h;
    bytes            b;
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  r;
    cloth_status     status;
    double           x[12], y[12], lambda[24], guess[24];
    qp_problem       p;
    int              i, n, m, fail;
    b.p = data, b.end = data + size;
    fail = (int)next(&b);
    p = make(&b);
    n = p.qp.n, m = p.qp.m;
    for (i = 0; i < n; i++) x[i] = 7;
    for (i = 0; i < m; i++) lambda[i] = 7, guess[i] = number(&b);
    if (fail & 1) o.guess = guess;
    if (fail & 2) require(cloth_qp_work_create(NULL, &o.work) == CLOTH_OK);
    o.hooks = fuzz_hooks(&h);
    h.fail_at = fail < 32 ? fail : 0;
    status = cloth_qp_solve(&p.qp, &o, x, lambda, &r);
    require(h.live == 0 && (status == CLOTH_OK) == (h.errors == 0));
    require((status == CLOTH_OK) == (r.outcome != CLOTH_QP_NONE));
    if (status) {
        for (i = 0; i < n; i++) require(x[i] >= 7 && x[i] <= 7);
        for (i = 0; i < m; i++) require(lambda[i] >= 7 && lambda[i] <= 7);
    } else if (r.outcome != CLOTH_QP_MAX_ITERATIONS) {
        all_finite(x, n);
        all_finite(lambda, m);
        for (i = 0; i < m; i++) require(lambda[i] >= 0);
        if (r.outcome == CLOTH_QP_INFEASIBLE) require(r.certificate < 0);
        else require(r.residual <= o.tolerance);
        h.fail_at = 0;
        require(cloth_qp_solve(&p.qp, &o, y, NULL, NULL) == CLOTH_OK);
        require(!memcmp(x, y, (size_t)n * sizeof *x));
    }
    cloth_qp_work_destroy(o.work);
    qp_free(&p);
    require(h.live == 0);
    return 0;
}

#ifdef FUZZ_MAIN
int main(int argc, char **argv) {
    if (argc < 2 || argv[1][0] != '-') return fuzz_replay(argc - 1, argv + 1, "fuzz_qp");
    fuzz_random(atof(argv[1] + 1), 251, "fuzz_qp");
    return 0;
}
#endif
