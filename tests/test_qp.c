/* test_qp.c - cloth_qp_solve against closed forms, enumeration of active sets, the public problems
 * (../shared) with certificates, bad input, failing allocator.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_qp.c -o test_qp -lm
 * tier: quick */
#include "clothsim_collide.h"
#include "test.h"
#include "host.h"
#include "qp_data.h"

static uint64_t seed = 1;

static unsigned pick(unsigned n) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(seed >> 33) % n;
}

static double rnd(void) { return ((double)pick(2000001) - 1e6) / 1e6; }

static void add_row(qp_problem *p, double h, int count, const int *col, const double *val) {
    int m = p->qp.m, at = p->row[m], k;
    for (k = 0; k < count; k++) {
        p->col[at + k] = col[k];
        p->val[at + k] = val[k];
    }
    p->h[m] = h;
    p->row[m + 1] = at + count;
    p->qp.m = m + 1;
}

/* n unknowns of mass 1 at 0, room for m rows of up to 12 entries, none yet */
static qp_problem blank(int n, int m) {
    qp_problem p;
    int        i;
    qp_make(&p, n, m, 12 * m);
    p.qp.m = 0;
    for (i = 0; i < n; i++) p.minv[i] = 1;
    return p;
}

/* Solves and checks the conditions; lambda may be NULL. */
static cloth_qp_report solve(const cloth_qp *q, double *x, double *lambda) {
    double         *l = lambda ? lambda : (double *)qp_get((size_t)q->m, sizeof *l);
    cloth_qp_report r;
    qp_kkt          k;
    CHECK(cloth_qp_solve(q, NULL, x, l, &r) == CLOTH_OK);
    CHECK(r.outcome == CLOTH_QP_SOLVED);
    k = qp_check(q, x, l);
    CHECK(k.worst <= 1e-12 && k.smallest >= 0 && r.residual <= 1e-12);
    CHECK_NEAR(r.objective, k.objective, 1e-12 * k.objective);
    if (!lambda) free(l);
    return r;
}

/* --- closed forms --- */

/* One vertex against a face: dx_i = -g w_i n / m_i / sum w^2/m (VALIDATION 1.k). */
static void one_contact(void) {
    const double w[4] = {1, -0.2, -0.3, -0.5}, m[4] = {1, 2, 4, 8}, n[3] = {0.6, 0, 0.8};
    const double gap = -0.01;
    int          i, k, all, col[12];
    double       val[12], x[12], lambda[2], sum = 0;
    qp_problem   p = blank(12, 2);
    for (i = 0; i < 4; i++) sum += w[i] * w[i] / m[i];
    for (k = 0; k < 12; k++) {
        p.minv[k] = 1 / m[k / 3];
        p.x0[k] = rnd();
        col[k] = k;
        val[k] = -w[k / 3] * n[k % 3];
    }
    for (all = 0; all < 2; all++) {         /* alone, and beside a row that does not matter */
        double at = 0;
        for (k = 0; k < 12; k++) at -= val[k] * p.x0[k];
        if (!all) add_row(&p, -at + gap, 12, col, val);     /* n.sum w x >= at - gap */
        else add_row(&p, 100, 12, col, val);
        solve(&p.qp, x, lambda);
        for (k = 0; k < 12; k++)
            CHECK_NEAR(x[k] - p.x0[k], -gap * w[k / 3] * n[k % 3] / m[k / 3] / sum, 1e-15);
        CHECK_NEAR(lambda[0], -gap / sum, 1e-15);
        CHECK(all == 0 || !(lambda[1] > 0));
    }
    p.h[0] += 1;                            /* not violated: nothing moves */
    p.qp.m = 1;
    solve(&p.qp, x, lambda);
    CHECK(!memcmp(x, p.x0, sizeof x) && !(lambda[0] > 0));
    qp_free(&p);
}

/* x in a box: every unknown goes to the nearer end. Exact. */
static void box(void) {
    enum { N = 700 };
    static double x[N], lambda[2 * N];
    qp_problem    p = blank(N, 2 * N);
    int           i;
    for (i = 0; i < N; i++) {
        const double one = 1, minus = -1;
        p.x0[i] = 2 * rnd();
        p.minv[i] = pow(10, 4 * rnd());
        add_row(&p, 1, 1, &i, &one);
        add_row(&p, 0.5, 1, &i, &minus);
    }
    CHECK(solve(&p.qp, x, lambda).precise == 0);
    for (i = 0; i < N; i++) CHECK_NEAR(x[i], fmin(fmax(p.x0[i], -0.5), 1), 1e-15);
    qp_free(&p);
}

/* n layers in one place that must stand d apart: x_i = (i - (n-1)/2) d; lambda_i, the force between
 * i and i+1, is d (i+1)(n-1-i)/2. Condition n^2/10: every row hears of every other. */
static void stack(void) {
    enum { N = 3000 };
    static double x[N], lambda[N];
    qp_problem    p = blank(N, N);
    const double  d = 1e-3, val[2] = {1, -1};
    int           i, col[2];
    for (i = 0; i + 1 < N; i++) {
        col[0] = i, col[1] = i + 1;
        add_row(&p, -d, 2, col, val);
    }
    CHECK(solve(&p.qp, x, lambda).active == N - 1);
    for (i = 0; i < N; i++) CHECK_NEAR(x[i], (i - 0.5 * (N - 1)) * d, 1e-14);
    for (i = 0; i + 1 < N; i++)
        CHECK_REL(lambda[i], 0.5 * d * (i + 1.0) * (N - 1 - i), 1e-9);
    p.minv[0] = 0;                          /* the lowest one lies on the floor */
    solve(&p.qp, x, lambda);
    for (i = 0; i < N; i++) CHECK_NEAR(x[i], i * d, 1e-14);
    qp_free(&p);
}

/* The wedge 0 <= y <= e (x - a), seen from the origin: its apex (a, 0), multipliers a / e. */
static void wedge(void) {
    int k;
    for (k = 1; k <= 30; k++) {
        const double e = ldexp(1, -k), a = 0.5, up = -1;
        const int    y = 1, xy[2] = {0, 1};
        double       x[2], lambda[2], down[2] = {0, 1};
        qp_problem   p = blank(2, 2);
        qp_kkt       c;
        down[0] = -e;
        add_row(&p, 0, 1, &y, &up);
        add_row(&p, -e * a, 2, xy, down);
        CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, NULL) == CLOTH_OK);
        c = qp_check(&p.qp, x, lambda);
        CHECK_NEAR(c.primal, 0, 1e-14);
        CHECK_NEAR(c.complementarity, 0, 1e-13);
        CHECK_NEAR(c.dual, 0, 1e-15 / e);   /* x is a difference of multipliers a / e */
        CHECK_NEAR(x[0], a, 1e-12);
        CHECK_NEAR(x[1], 0, 1e-15);
        CHECK_REL(lambda[1], a / e, 1e-12);
        qp_free(&p);
    }
}

/* A multiplier of 1e-314 has few digits, and x is made of it: by long doubles x + minv G'l is 9e-11
 * of x then. It is the largest residual: solved to 2e-10, not to 4e-11. */
static void few_digits(void) {
    static const double tolerance[2] = {2e-10, 4e-11};
    const int           col = 0;
    const double        g = -1.7;
    qp_kkt              c[2];
    int                 k;
    for (k = 0; k < 2; k++) {
        cloth_qp_options o = cloth_qp_options_default();
        cloth_qp_report  r;
        double           x, lambda;
        qp_problem       p = blank(1, 1);
        p.minv[0] = 1e300;
        add_row(&p, -1.1e-13, 1, &col, &g);
        o.tolerance = tolerance[k];
        CHECK(cloth_qp_solve(&p.qp, &o, &x, &lambda, &r) == CLOTH_OK);
        c[k] = qp_check(&p.qp, &x, &lambda);
        CHECK(r.outcome == (k ? CLOTH_QP_MAX_ITERATIONS : CLOTH_QP_SOLVED));
        CHECK(r.residual > 4e-11 && r.residual < 2e-10);
        qp_free(&p);
    }
    if (!test_long_double()) SKIP("long double has the bits of double here");
    for (k = 0; k < 2; k++)
        CHECK(c[k].dual > 8e-11 && c[k].dual < 1e-10 && c[k].primal < 4e-11 &&
              c[k].complementarity < 4e-11);
}

/* The same contact seen 4 times, as a copy, scaled, tilted a little, and looser. */
static void duplicates(void) {
    const int    col[3] = {0, 1, 2};
    const double val[3] = {-1, -2, -2}, twice[3] = {-2, -4, -4}, third[3] = {-1 / 3.0, -2 / 3.0,
                                                                              -2 / 3.0};
    double       x[3], lambda[4], tilted[3] = {-1, -2, -2};
    int          k, i;
    for (k = 0; k <= 16; k++) {
        qp_problem p = blank(3, 4);
        tilted[0] = -1 - pow(10, -k);
        add_row(&p, -9, 3, col, val);
        add_row(&p, -18, 3, col, twice);
        add_row(&p, -3, 3, col, third);
        add_row(&p, -8, 3, col, tilted);
        CHECK(solve(&p.qp, x, lambda).dropped >= 2);
        for (i = 0; i < 3; i++) CHECK_NEAR(x[i], i ? 2 : 1, 1e-15);
        qp_free(&p);
    }
}

/* Twelve planes through the optimum of one of them: multipliers are not unique, x is. */
static void degenerate(void) {
    const int col[3] = {0, 1, 2};
    double    x[3], lambda[12];
    int       k, trial;
    for (trial = 0; trial < 50; trial++) {
        qp_problem p = blank(3, 12);
        for (k = 0; k < 12; k++) {
            double n[3];
            n[0] = k ? 0.125 * (int)(pick(17) - 8.0) : 0;
            n[1] = k ? 0.125 * (int)(pick(17) - 8.0) : 0;
            n[2] = -1;
            add_row(&p, -1 + (n[0] + n[1]) * 0.5, 3, col, n);
        }
        p.x0[0] = p.x0[1] = 0.5;
        solve(&p.qp, x, lambda);
        for (k = 0; k < 3; k++) CHECK_NEAR(x[k], k < 2 ? 0.5 : 1, 1e-15);
        qp_free(&p);
    }
}

/* Rows whose unknowns are all fixed; a column twice in a row; entries that cancel; no rows. */
static void special_rows(void) {
    const int       col[3] = {0, 1, 1}, other[2] = {2, 2};
    const double    val[3] = {1, 2, -3}, cancel[2] = {1, -1}, one = 1;
    double          x[3], lambda[3];
    cloth_qp_report r;
    qp_problem      p = blank(3, 3);
    p.minv[0] = 0;
    p.x0[0] = 2;
    add_row(&p, 3, 1, col, &one);                           /* 2 <= 3                */
    add_row(&p, 1.5, 3, col, val);                          /* 2 - x1 <= 1.5         */
    add_row(&p, 0, 2, other, cancel);                       /* 0 <= 0                */
    r = solve(&p.qp, x, lambda);
    CHECK(r.dropped == 2 && r.active == 1);
    CHECK_NEAR(x[0], 2, 0);
    CHECK_NEAR(x[1], 0.5, 1e-15);
    p.h[0] = 1;                                             /* 2 <= 1                */
    CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, &r) == CLOTH_OK);
    CHECK(r.outcome == CLOTH_QP_INFEASIBLE && qp_is_farkas(&p.qp, lambda));
    CHECK_NEAR(r.certificate, -1, 1e-15);
    p.h[0] = 3;
    p.h[2] = -1;                                            /* 0 <= -1               */
    CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, &r) == CLOTH_OK);
    CHECK(r.outcome == CLOTH_QP_INFEASIBLE && qp_is_farkas(&p.qp, lambda));
    p.qp.m = 0;
    r = solve(&p.qp, x, lambda);
    CHECK(!memcmp(x, p.x0, sizeof x) && r.iterations == 0);
    qp_free(&p);
}

/* c >= 3 and c <= 1; three half planes; a sheet of contacts pinched between two plates. */
static void contradictions(void) {
    enum { N = 400 };
    static double   x[N], lambda[2 * N];
    const double    up = 1, down = -1;
    const double    n[3][2] = {{1, 0}, {-0.5, 0.75}, {-0.5, -0.75}};
    const int       xy[2] = {0, 1};
    cloth_qp_report r;
    qp_problem      p = blank(1, 2), q = blank(2, 3), s = blank(N, 2 * N);
    int             i, all;
    add_row(&p, -3, 1, xy, &down);
    add_row(&p, 1, 1, xy, &up);
    for (i = 0; i < 3; i++) add_row(&q, -1, 2, xy, n[i]);
    for (i = 0; i < N; i++) {               /* neighbours coupled, the last one without room */
        double val[2] = {-1, -0.25};
        int    col[2];
        col[0] = i, col[1] = (i + 1) % N;
        s.x0[i] = 0.01 * rnd();
        add_row(&s, 0, 2, col, val);
        val[0] = 1, val[1] = 0.25;
        add_row(&s, i + 1 < N ? 0.001 : -1e-6, 2, col, val);
    }
    for (all = 0; all < 3; all++) {
        const cloth_qp *prob = all == 0 ? &p.qp : all == 1 ? &q.qp : &s.qp;
        CHECK(cloth_qp_solve(prob, NULL, x, lambda, &r) == CLOTH_OK);
        CHECK(r.outcome == CLOTH_QP_INFEASIBLE && qp_is_farkas(prob, lambda));
        CHECK(!memcmp(x, prob->x0, (size_t)prob->n * sizeof *x));
        if (all == 0) CHECK_NEAR(r.certificate, -2, 1e-15);
        if (all == 2) CHECK_NEAR(r.certificate, -1e-6, 1e-18);
    }
    p.h[1] = 3;                             /* just enough room: c = 3 */
    solve(&p.qp, x, lambda);
    CHECK_NEAR(x[0], 3, 1e-15);
    qp_free(&p);
    qp_free(&q);
    qp_free(&s);
}

/* Rows with room at a point, after a few sets, beside a row in other units that takes no part. */
static void no_contradiction(void) {
    const int    last = 5;
    const double large = 1e12;
    int          trial, i, k, wrong = 0;
    for (trial = 0; trial < 3000; trial++) {
        const int        col[5] = {0, 1, 2, 3, 4};
        cloth_qp_options o = cloth_qp_options_default();
        cloth_qp_report  r;
        qp_problem       p = blank(6, 9);
        double           x[6], lambda[9], point[5];
        for (k = 0; k < 5; k++) point[k] = 3 * rnd();
        for (i = 0; i < 8; i++) {
            double val[5], room = 0.01;
            for (k = 0; k < 5; k++) val[k] = rnd(), room += val[k] * point[k];
            add_row(&p, room, 5, col, val);
        }
        add_row(&p, large, 1, &last, &large);
        o.max_iterations = 1 + trial % 3;
        CHECK(cloth_qp_solve(&p.qp, &o, x, lambda, &r) == CLOTH_OK);
        wrong += r.outcome == CLOTH_QP_INFEASIBLE;
        qp_free(&p);
    }
    CHECK(wrong == 0);
}

/* A certificate that mass ratios of 1e15 hide from the active set: its multipliers grow to 1e25. */
static void far_contradiction(void) {
    const int       col[4] = {2, 1, 1, 2};
    const double    val[4] = {0.65327207487671091, 0.43538518949145821, -0.21935435393157933, -1};
    const double    h[3] = {-0.32260501889316301, -0.89250318152652253, -0.032177548507392906};
    cloth_qp_report r;
    qp_problem      p = blank(3, 3);
    double          x[3], lambda[3];
    int             k;
    p.minv[0] = 2414.5719818006801, p.minv[1] = 39313512.54396762;
    p.x0[0] = 1.7739648291624341, p.x0[1] = 1.1580410241015864, p.x0[2] = 0.7852624357858331;
    for (k = 0; k < 3; k++) add_row(&p, h[k], k < 2 ? 1 : 2, col + k, val + k);
    for (k = 0; k < 20; k++) {
        p.minv[2] = pow(10, -k);
        CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, &r) == CLOTH_OK);
        CHECK(r.outcome == CLOTH_QP_INFEASIBLE && qp_is_farkas(&p.qp, lambda));
        CHECK(r.certificate < 0 && r.residual == 0);
    }
    qp_free(&p);
}

/* Entries that couple with one row and underflow with another, beside two rows that need twice the
 * digits: x would have to move by 1e324 units, nothing outside of the arrays is touched. */
static void underflow(void) {
    enum { M = 42 };
    double          x[2], lambda[M];
    const int       col[2] = {0, 1};
    cloth_qp_report r;
    qp_problem      p = blank(2, M);
    int             i;
    p.minv[1] = 5e-324;
    for (i = 0; i < M; i++) {
        const double tiny = 1e-200, val[2] = {i % 2 ? 1.0 : -1.0, 0.1};
        if (i + 2 < M) add_row(&p, 1, 1, col + 1, &tiny);
        else add_row(&p, -1, 2, col, val);
    }
    CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, &r) == CLOTH_OK);
    CHECK(r.outcome == CLOTH_QP_MAX_ITERATIONS && r.precise && r.dropped == M - 2);
    qp_free(&p);
}

/* --- enumeration --- */

/* Gaussian elimination by columns, largest pivot first, in long double; 0 when singular. */
static int eliminate(int n, long double a[6][7]) {
    int i, j, k;
    for (i = 0; i < n; i++) {
        int pr = i;
        for (j = i; j < n; j++)
            if (fabsl(a[j][i]) > fabsl(a[pr][i])) pr = j;
        if (!(fabsl(a[pr][i]) > 1e-12L)) return 0;
        for (k = 0; k <= n; k++) {
            const long double t = a[i][k];
            a[i][k] = a[pr][k];
            a[pr][k] = t;
        }
        for (j = 0; j < n; j++) {
            const long double f = a[j][i] / a[i][i];
            for (k = i; k <= n && j != i; k++) a[j][k] -= f * a[i][k];
        }
    }
    for (i = 0; i < n; i++) a[i][n] /= a[i][i];
    return 1;
}

/* The optimum of a dense problem by trying every set of rows as equations. */
static int enumerate(const qp_problem *p, double *x) {
    const int    n = p->qp.n, m = p->qp.m;
    long double  best = HUGE_VALL;
    unsigned     set;
    int          i, j, k, found = 0;
    for (set = 0; set < 1u << m; set++) {
        int         list[6], size = 0, good = 1;
        long double a[6][7], y[6], cost = 0;
        for (i = 0; i < m; i++)
            if (set >> i & 1u && size < 6) list[size++] = i;
        for (i = 0; i < size; i++) {
            a[i][size] = -(long double)p->h[list[i]];
            for (k = 0; k < n; k++)
                a[i][size] += (long double)p->val[list[i] * n + k] * (long double)p->x0[k];
            for (j = 0; j < size; j++)
                for (a[i][j] = 0, k = 0; k < n; k++)
                    a[i][j] += (long double)p->val[list[i] * n + k] *
                               (long double)p->val[list[j] * n + k] * (long double)p->minv[k];
        }
        if (!eliminate(size, a)) continue;
        for (i = 0; i < size; i++) good &= a[i][size] >= 0;
        for (k = 0; k < n; k++) {
            const long double x0 = (long double)p->x0[k], minv = (long double)p->minv[k];
            for (y[k] = x0, i = 0; i < size; i++)
                y[k] -= minv * (long double)p->val[list[i] * n + k] * a[i][size];
            if (p->minv[k] > 0) cost += (y[k] - x0) * (y[k] - x0) / minv;
        }
        for (i = 0; i < m && good; i++) {
            long double s = (long double)p->h[i], scale = 1 + fabsl(s);
            for (k = 0; k < n; k++) {
                s -= (long double)p->val[i * n + k] * y[k];
                scale += fabsl((long double)p->val[i * n + k] * y[k]);
            }
            good &= s >= -1e-12L * scale;
        }
        if (!good || !(cost < best)) continue;
        best = cost;
        found = 1;
        for (k = 0; k < n; k++) x[k] = (double)y[k];
    }
    return found;
}

static void enumeration(void) {
    int trial, solved = 0, infeasible = 0;
    for (trial = 0; trial < 3000; trial++) {
        const int       n = 1 + (int)pick(5), m = 1 + (int)pick(6), coarse = (int)pick(2);
        int             i, k, same = 1;
        qp_problem      p;
        double          x[6], ref[6], lambda[6], big = 1;
        cloth_qp_report r;
        qp_make(&p, n, m, n * m);
        for (k = 0; k < n; k++) {
            p.x0[k] = coarse ? (int)pick(9) - 4 : rnd();
            p.minv[k] = pick(6) ? 1 + 3 * (int)pick(3) : 0;
        }
        for (i = 0; i < m; i++) {
            p.h[i] = coarse ? (int)pick(9) - 4 : rnd() - 0.3;
            p.row[i + 1] = n * (i + 1);
            for (k = 0; k < n; k++) {
                p.col[n * i + k] = k;
                p.val[n * i + k] = coarse ? (int)pick(5) - 2 : rnd();
            }
        }
        CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, &r) == CLOTH_OK);
        if (enumerate(&p, ref)) {
            solved++;
            same &= r.outcome == CLOTH_QP_SOLVED;
            for (k = 0; k < n; k++) big = fmax(big, fabs(ref[k]));
            for (k = 0; k < n; k++) same &= fabs(x[k] - ref[k]) <= 1e-10 * big;
        } else {
            infeasible++;
            same &= r.outcome == CLOTH_QP_INFEASIBLE && qp_is_farkas(&p.qp, lambda);
        }
        CHECK(same);
        if (!same)
            printf("  trial %d: n %d m %d outcome %d\n", trial, n, m, (int)r.outcome);
        qp_free(&p);
    }
    printf("  %d with an optimum, %d without\n", solved, infeasible);
    CHECK(solved > 1000 && infeasible > 300);
}

/* Copies that differ in the last digits or any digit before, opposite rows, masses over 12
 * decades: solved or proved, or honestly neither in a few of 10000. */
static void nasty(void) {
    int trial, neither = 0, wrong = 0, trials = test_quick() ? 5000 : 30000;
    for (trial = 0; trial < trials; trial++) {
        const int       n = 1 + (int)pick(8), m = 1 + (int)pick(20);
        int             i, k, at = 0;
        qp_problem      p;
        double          x[8], lambda[20];
        cloth_qp_report r;
        qp_make(&p, n, m, n * m);
        for (k = 0; k < n; k++) {
            p.x0[k] = pick(3) ? rnd() : (int)pick(5) - 2;
            p.minv[k] = pick(8) ? pow(10, (int)pick(13) - 6) : 0;
        }
        for (i = 0; i < m; i++) {
            const int    copy = i && pick(3) == 0 ? (int)pick((unsigned)i) : -1;
            const double scale = (pick(4) ? 1 : -1) * pow(10, (int)pick(5) - 2);
            const double e = pick(2) ? pow(10, -(int)pick(16)) : 0;
            if (copy >= 0) {
                for (k = p.row[copy]; k < p.row[copy + 1]; k++) {
                    p.col[at] = p.col[k];
                    p.val[at++] = scale * p.val[k] * (1 + e * rnd());
                }
                p.h[i] = scale * p.h[copy] + (pick(4) ? 0 : 0.1);
            } else {
                for (k = 0; k < n; k++)
                    if (pick(3)) {
                        p.col[at] = k;
                        p.val[at++] = rnd();
                    }
                p.h[i] = rnd();
            }
            p.row[i + 1] = at;
        }
        CHECK(cloth_qp_solve(&p.qp, NULL, x, lambda, &r) == CLOTH_OK);
        if (r.outcome == CLOTH_QP_SOLVED) {
            /* multipliers may be 1e15 here and x their difference: the dual residual is relative
             * to them in the report, the other two are not */
            const qp_kkt c = qp_check(&p.qp, x, lambda);
            wrong += !(c.smallest >= 0 && r.residual <= 1e-9);
        } else if (r.outcome == CLOTH_QP_INFEASIBLE) wrong += !qp_is_farkas(&p.qp, lambda);
        else neither++;
        qp_free(&p);
    }
    printf("  %d of %d undecided\n", neither, trials);
    CHECK(wrong == 0 && neither * 1000 <= trials);
}

/* --- the public problems --- */

static const char *const files[] = {
    "random", "duplicate", "nearparallel", "degenerate", "fixed", "infeasible", "massratio",
    "large"};

static int    problems;                     /* of all files                                    */
static double worst_kkt, farthest[2];       /* well posed, nearly parallel                     */

static void one_problem(const qp_problem *p, int ill, double *far) {
    const cloth_qp *q = &p->qp;
    double         *x = (double *)qp_get((size_t)q->n, sizeof *x);
    double         *lambda = (double *)qp_get((size_t)q->m, sizeof *lambda), error = 0;
    cloth_qp_report r;
    qp_kkt          ours, ref;
    int             i, bad = test_bad;
    CHECK(cloth_qp_solve(q, NULL, x, lambda, &r) == CLOTH_OK);
    CHECK(r.outcome == (p->infeasible ? CLOTH_QP_INFEASIBLE : CLOTH_QP_SOLVED));
    if (p->infeasible) {
        CHECK(qp_is_farkas(q, lambda));
    } else {
        ours = qp_check(q, x, lambda);
        ref = qp_check(q, p->x, p->lambda);
        for (i = 0; i < q->n; i++) error = fmax(error, fabs(x[i] - p->x[i]));
        CHECK(ours.worst <= 1e-9 && ours.smallest >= 0 && r.residual <= 1e-9);
        CHECK(fabs(ours.objective - ref.objective) <= 1e-10 * ref.objective);
        CHECK(error <= (ill ? 1e-6 : 1e-8));
        *far = fmax(*far, error);
        worst_kkt = fmax(worst_kkt, ours.worst);
        farthest[ill] = fmax(farthest[ill], error);
    }
    problems++;
    if (test_bad > bad) printf("  in %s, off by %.1e\n", p->name, error);
    free(x);
    free(lambda);
}

static void one_file(const char *name) {
    const char *path = test_shared(name);
    FILE       *f = *path ? fopen(path, "r") : NULL;
    qp_problem  p;
    double      far = 0;
    int         count = 0;
    if (!f) SKIP("no ../shared/data/qp");
    for (; qp_read(f, &p); count++) {
        one_problem(&p, strstr(name, "nearparallel") != NULL, &far);
        qp_free(&p);
    }
    fclose(f);
    printf("  %-32s %3d problems, farthest %.1e\n", name, count, far);
    CHECK(count > 5);
}

static void public_synthetic(void) {
    char     name[64];
    unsigned i;
    for (i = 0; i < sizeof files / sizeof *files && !test_skip; i++) {
        snprintf(name, sizeof name, "data/qp/synth_%s.qp", files[i]);
        one_file(name);
    }
}

static void public_contact(void) { one_file("data/qp/contact.qp"); }

static void public_maros_meszaros(void) {
    one_file("data/qp/marosmeszaros.qp");
    printf("  all %d problems: KKT residual %.1e, x off by %.1e, of nearly parallel rows %.1e\n",
           problems, worst_kkt, farthest[0], farthest[1]);
}

/* --- invariance, start, memory --- */

/* m rows over about m / 2 vertices of two sheets, with near copies of every fourth row */
static qp_problem zone(int m, double tilt) {
    const int  nv = 4 + m / 2;
    qp_problem p = blank(3 * nv, m);
    int        i, k;
    for (i = 0; i < 3 * nv; i++) {
        p.x0[i] = rnd();
        p.minv[i] = i % 3 ? p.minv[i - 1] : 1 + 0.9 * rnd();
    }
    for (i = 0; i < m; i++) {
        const double w[4] = {1, -0.25, -0.375, -0.375};
        double       n[3], val[12];
        int          col[12], v[4];
        for (k = 0; k < 4; k++) v[k] = (i / 2 + (k ? 1 + (int)pick(2) + (k - 1) : 0)) % nv;
        v[2] = (v[1] + 1) % nv, v[3] = (v[1] + 2) % nv;
        n[0] = rnd(), n[1] = rnd(), n[2] = 1 + rnd();
        for (k = 0; k < 12; k++) {
            col[k] = 3 * v[k / 3] + k % 3;
            val[k] = w[k / 3] * n[k % 3];
        }
        if (i % 4 == 3)                     /* the row before, tilted */
            for (k = 0; k < 12; k++) {
                col[k] = p.col[12 * (i - 1) + k];
                val[k] = p.val[12 * (i - 1) + k] * (1 + tilt * rnd());
            }
        add_row(&p, i % 4 == 3 ? p.h[i - 1] * (1 + tilt * rnd()) : 0.5 * rnd(), 12, col, val);
    }
    return p;
}

/* Rows and masses times powers of two: the same x to the bit. Rows in another order: 1e-12. */
static void invariance(void) {
    enum { M = 60 };
    static double x[3 * M], y[3 * M], lambda[M];
    qp_problem    p = zone(M, 1e-3), q = zone(M, 1e-3);
    int           i, k, n = p.qp.n;
    solve(&p.qp, x, lambda);
    for (i = 0; i < M; i++) {
        const double s = ldexp(1, (int)pick(40) - 20);
        p.h[i] *= s;
        for (k = p.row[i]; k < p.row[i + 1]; k++) p.val[k] *= s;
    }
    solve(&p.qp, y, lambda);
    CHECK(!memcmp(x, y, (size_t)n * sizeof *x));
    for (i = 0; i < n; i++) p.minv[i] *= 1024;
    solve(&p.qp, y, lambda);
    CHECK(!memcmp(x, y, (size_t)n * sizeof *x));
    memcpy(q.x0, p.x0, (size_t)n * sizeof *x);
    memcpy(q.minv, p.minv, (size_t)n * sizeof *x);
    for (i = 0; i < M; i++) {
        const int from = (i * 7 + 3) % M;
        q.h[i] = p.h[from];
        memcpy(q.val + 12 * i, p.val + 12 * from, 12 * sizeof *q.val);
        memcpy(q.col + 12 * i, p.col + 12 * from, 12 * sizeof *q.col);
    }
    solve(&q.qp, y, lambda);
    for (i = 0; i < n; i++) CHECK_NEAR(x[i], y[i], 1e-12);
    qp_free(&p);
    qp_free(&q);
}

/* Any start, with work or without, gives the same bits here: the active rows are independent. */
static void start(void) {
    enum { M = 100 };
    static double    x[3 * M], y[3 * M], lambda[M], other[M], guess[M];
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  r, cold;
    int              i, kind, trial;
    for (trial = 0; trial < 20; trial++) {
        qp_problem p = zone(M, trial % 2 ? 0.1 : 1e-6);
        cold = solve(&p.qp, x, lambda);
        CHECK(cloth_qp_work_create(NULL, &o.work) == CLOTH_OK);
        for (kind = 0; kind < 4; kind++) {
            for (i = 0; i < M; i++)
                guess[i] = kind == 0 ? 0 : kind == 1 ? 1 : kind == 2 ? lambda[i] : rnd();
            o.guess = guess;
            memset(y, 0, sizeof y);
            CHECK(cloth_qp_solve(&p.qp, &o, y, other, &r) == CLOTH_OK);
            CHECK(r.outcome == CLOTH_QP_SOLVED);
            CHECK(!memcmp(x, y, (size_t)p.qp.n * sizeof *x));
            CHECK(!memcmp(lambda, other, sizeof other));
            if (kind == 2) CHECK(r.iterations <= 1 + cold.precise);
        }
        cloth_qp_work_destroy(o.work);
        qp_free(&p);
    }
}

static void memory(void) {
    static double    x[3000], y[3000], lambda[600], was[600];
    static host      h;
    cloth_hooks      hooks = host_hooks(&h);
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  r;
    int              kind, n, calls;
    size_t           bytes;
    o.hooks = hooks;
    for (kind = 0; kind < 2; kind++) {      /* plain doubles; twice the digits */
        qp_problem p = zone(500, kind ? 1e-12 : 0.1), small = p;
        memset(x, 7, sizeof x);
        memset(lambda, 7, sizeof lambda);
        memcpy(y, x, sizeof x);
        memcpy(was, lambda, sizeof was);
        for (n = 1; n < 100; n++) {
            cloth_status status;
            host_hooks(&h);
            h.fail_at = n;
            status = cloth_qp_solve(&p.qp, &o, x, lambda, &r);
            CHECK(h.live == 0);
            if (status == CLOTH_OK) break;
            CHECK(status == CLOTH_ERR_MEMORY && h.errors == 1 && r.outcome == CLOTH_QP_NONE);
            CHECK(!memcmp(x, y, sizeof x) && !memcmp(lambda, was, sizeof was));
        }
        CHECK(n > 5 && n < 100 && r.outcome == CLOTH_QP_SOLVED && r.precise == kind);
        host_hooks(&h);
        h.fail_at = 1;
        CHECK(cloth_qp_work_create(&hooks, &o.work) == CLOTH_ERR_MEMORY && !o.work);
        CHECK(cloth_qp_work_create(&hooks, NULL) == CLOTH_ERR_ARGUMENT);
        CHECK(cloth_qp_work_create(&hooks, &o.work) == CLOTH_OK);
        CHECK(cloth_qp_solve(&p.qp, &o, x, lambda, &r) == CLOTH_OK);
        calls = h.calls;
        bytes = cloth_qp_work_bytes(o.work);
        CHECK(bytes > 10000 && cloth_qp_work_bytes(NULL) == 0);
        CHECK(cloth_qp_solve(&p.qp, &o, y, lambda, &r) == CLOTH_OK);
        small.qp.m = 450;                   /* the same without its last rows */
        CHECK(cloth_qp_solve(&small.qp, &o, y, lambda, &r) == CLOTH_OK);
        CHECK(h.calls == calls && cloth_qp_work_bytes(o.work) == bytes);
        cloth_qp_work_destroy(o.work);
        cloth_qp_work_destroy(NULL);
        o.work = NULL;
        CHECK(h.live == 0);
        qp_free(&p);
    }
}

static int say_stop(void *user) { return ++*(int *)user > 1; }

static void limits(void) {
    static double    x[3000], lambda[500];
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  r;
    qp_problem       p = zone(500, 1e-9);
    int              asked = 0;
    o.max_iterations = 1;
    CHECK(cloth_qp_solve(&p.qp, &o, x, lambda, &r) == CLOTH_OK);
    CHECK(r.outcome == CLOTH_QP_MAX_ITERATIONS && r.iterations == 1 && r.residual > 1e-9);
    o.max_iterations = 0;
    o.hooks.cancel.fn = say_stop;
    o.hooks.cancel.user = &asked;
    CHECK(cloth_qp_solve(&p.qp, &o, x, lambda, &r) == CLOTH_ERR_CANCELLED && asked == 2);
    o = cloth_qp_options_default();
    CHECK(cloth_qp_solve(&p.qp, &o, NULL, NULL, NULL) == CLOTH_OK);
    qp_free(&p);
}

/* Rows without entries need no arrays of them. */
static void empty_rows(void) {
    qp_problem      p = blank(2, 2);
    cloth_qp        q;
    cloth_qp_report r;
    double          x[2], lambda[2];
    int             none = 0;
    add_row(&p, 1, 0, &none, p.val), add_row(&p, 0, 0, &none, p.val);
    q = p.qp, q.col = NULL, q.val = NULL;
    CHECK(cloth_qp_solve(&q, NULL, x, lambda, &r) == CLOTH_OK && r.outcome == CLOTH_QP_SOLVED);
    p.h[1] = -1;
    CHECK(cloth_qp_solve(&q, NULL, x, lambda, &r) == CLOTH_OK && r.outcome == CLOTH_QP_INFEASIBLE);
    qp_free(&p);
}

/* --- bad input --- */

/* The call fails, says `word`, and leaves x and lambda. */
static void refused(const cloth_qp *q, cloth_qp_options o, cloth_status expect, const char *word) {
    static host     h;
    double          x[4] = {7, 7, 7, 7}, lambda[4] = {7, 7, 7, 7};
    cloth_qp_report r;
    cloth_status    status;
    o.hooks = host_hooks(&h);
    status = cloth_qp_solve(q, &o, x, lambda, &r);
    CHECK(status == expect && h.errors == 1 && strstr(h.text, word) != NULL && h.live == 0);
    if (status != expect || !strstr(h.text, word))
        printf("  status %d, said '%s', not '%s'\n", (int)status, h.text, word);
    CHECK_NEAR(x[0] + x[3] + lambda[0] + lambda[3], 28, 0);
    CHECK(r.outcome == CLOTH_QP_NONE);
}

static void bad_input(void) {
    cloth_qp_options o = cloth_qp_options_default(), bad;
    const int        col[2] = {0, 1};
    const double     val[2] = {1, 1}, tiny[1] = {1e-200};
    double           guess[2] = {0, 0};
    int              i;
    qp_problem       p = blank(2, 2);
    cloth_qp         q;
    add_row(&p, -1, 2, col, val);
    add_row(&p, -2, 1, col, val);
    q = p.qp;
    refused(NULL, o, CLOTH_ERR_ARGUMENT, "qp is NULL");
    q.n = 0, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.n = 0"), q = p.qp;
    q.n = -3, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.n = -3"), q = p.qp;
    q.m = -1, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.m = -1"), q = p.qp;
    q.m = 0x7fffffff, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.m = 2147483647"), q = p.qp;
    q.minv = NULL, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.minv is NULL"), q = p.qp;
    q.x0 = NULL, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.x0 is NULL"), q = p.qp;
    q.row = NULL, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.row is NULL"), q = p.qp;
    q.col = NULL, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.col is NULL"), q = p.qp;
    q.val = NULL, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.val is NULL"), q = p.qp;
    q.h = NULL, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.h is NULL"), q = p.qp;
    p.minv[1] = -1, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.minv[1] = -1"), p.minv[1] = 1;
    p.minv[0] = HOST_INFINITY, refused(&q, o, CLOTH_ERR_NONFINITE, "qp.minv[0] = inf");
    p.minv[0] = 1;
    p.x0[1] = HOST_NAN, refused(&q, o, CLOTH_ERR_NONFINITE, "qp.x0[1] = NaN"), p.x0[1] = 0;
    p.val[2] = -HOST_INFINITY, refused(&q, o, CLOTH_ERR_NONFINITE, "qp.val[2] = -inf");
    p.val[2] = 1;
    p.h[1] = HOST_NAN, refused(&q, o, CLOTH_ERR_NONFINITE, "qp.h[1] = NaN"), p.h[1] = 0;
    p.row[0] = 1, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.row[0] = 1"), p.row[0] = 0;
    p.row[1] = 4, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.row[2] = 3"), p.row[1] = 2;
    p.col[2] = 2, refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.col[2] = 2"), p.col[2] = -1;
    refused(&q, o, CLOTH_ERR_ARGUMENT, "qp.col[2] = -1"), p.col[2] = 0;
    p.h[1] = 1e305, p.val[2] = 1e-5;
    refused(&q, o, CLOTH_ERR_ARGUMENT, "qp row 1");
    p.h[1] = -1, p.val[2] = 1e305;
    refused(&q, o, CLOTH_ERR_ARGUMENT, "qp row 1");
    p.val[2] = 1;
    bad = o, bad.tolerance = 0, refused(&q, bad, CLOTH_ERR_ARGUMENT, "options.tolerance = 0");
    bad.tolerance = HOST_NAN, refused(&q, bad, CLOTH_ERR_ARGUMENT, "options.tolerance = NaN");
    bad = o, bad.max_iterations = -1;
    refused(&q, bad, CLOTH_ERR_ARGUMENT, "options.max_iterations = -1");
    guess[1] = HOST_NAN, bad = o, bad.guess = guess;
    refused(&q, bad, CLOTH_ERR_NONFINITE, "options.guess[1] = NaN");
    memset(&bad, 0, sizeof bad);
    CHECK(cloth_qp_solve(&q, &bad, NULL, NULL, NULL) == CLOTH_ERR_UNINIT);
    qp_free(&p);
    p = blank(2, 2);                        /* the row fits, lambda = 1e400 does not */
    add_row(&p, -1, 1, col, tiny);
    refused(&p.qp, o, CLOTH_ERR_NONFINITE, "out of range");
    qp_free(&p);
    p = blank(1, 50000);                    /* 50 000 rows of one unknown: 2.5e9 pairs */
    for (i = 0; i < 50000; i++) add_row(&p, -1, 1, col, val);
    refused(&p.qp, o, CLOTH_ERR_CAPACITY, "qp.m = 50000");
    qp_free(&p);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(one_contact);
    RUN(box);
    RUN(stack);
    RUN(wedge);
    RUN(few_digits);
    RUN(duplicates);
    RUN(degenerate);
    RUN(special_rows);
    RUN(contradictions);
    RUN(far_contradiction);
    RUN(underflow);
    RUN(enumeration);
    RUN(nasty);
    RUN(public_synthetic);
    RUN(public_contact);
    RUN(public_maros_meszaros);
    RUN(invariance);
    RUN(start);
    RUN(memory);
    RUN(limits);
    RUN(empty_rows);
    RUN(bad_input);
    RUN(no_contradiction);
    return TEST_END();
}
