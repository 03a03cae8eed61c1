/* test_optimise.c - the optimisers of the examples: a curved valley, bad scales, a wall of failed
 * runs, values with noise; Adam on a function that jumps.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_optimise.c -lm && ./a.out */
#include "../examples/optimise.h"
#include "test.h"

enum { N = 10 };

typedef struct told {
    int    n, runs, bad;                    /* bad: runs beyond the wall                       */
    double wall, noise, jump;
    double last;
    int    steps, rising;                   /* steps whose value is not below the last         */
} told;

/* Rosenbrock's valley, in pairs: 0 at (1, .., 1). */
static double valley(const double *p, double *g, void *user) {
    told  *t = (told *)user;
    double f = 0;
    t->runs++;
    for (int i = 0; i < t->n; i += 2) {
        const double a = 1 - p[i], b = p[i + 1] - p[i] * p[i];
        f += a * a + 100 * b * b;
        g[i] = -2 * a - 400 * b * p[i];
        g[i + 1] = 200 * b;
    }
    return f;
}

/* sum_i 10^(i/4) (p_i - 0.9)^2; fails beyond the wall; plus noise; plus steps. */
static double bowl(const double *p, double *g, void *user) {
    told  *t = (told *)user;
    double f = 0, size = 1;
    t->runs++;
    for (int i = 0; i < t->n; i++, size *= sqrt(sqrt(10.0))) {
        if (fabs(p[i]) > t->wall) return t->bad++, t->bad % 2 ? HUGE_VAL : (double)NAN;
        f += size * (p[i] - 0.9) * (p[i] - 0.9);
        g[i] = 2 * size * (p[i] - 0.9);
        f += t->jump * floor(20 * p[i]);
    }
    return f + t->noise * sin(1e6 * p[0] + 1e5 * p[1]) + 1;
}

static void hear(int k, double f, const double *p, void *user) {
    told *t = (told *)user;
    (void)p;
    if (k != t->steps++ || (k > 0 && !(f < t->last))) t->rising++;
    t->last = f;
}

static told told_make(int n) {
    told t;
    memset(&t, 0, sizeof t);
    t.n = n, t.wall = HUGE_VAL;
    return t;
}

static void lbfgs_valley(void) {
    told             t = told_make(N);
    optimise_options o = optimise_default();
    optimise_result  r;
    double           p[N];
    for (int i = 0; i < N; i++) p[i] = i % 2 ? 1 : -1.2;
    o.step = hear, o.slope = 1e-9, o.change = 0;
    r = optimise_lbfgs(N, p, valley, &t, &o);
    CHECK(r.end == OPTIMISE_SLOPE);
    CHECK(r.f < 1e-16 && r.runs == t.runs && r.runs < 100 && r.failed == 0);
    CHECK(t.steps == r.iterations && t.rising == 0);
    for (int i = 0; i < N; i++) CHECK_NEAR(p[i], 1, 1e-8);
}

/* On a quadratic: some n steps, as conjugate gradients. */
static void lbfgs_scales(void) {
    told             t = told_make(N);
    optimise_options o = optimise_default();
    double           p[N];
    optimise_result  r;
    for (int i = 0; i < N; i++) p[i] = -3 + i;
    o.slope = 1e-8, o.change = 0;
    r = optimise_lbfgs(N, p, bowl, &t, &o);
    CHECK(r.runs < 100);
    CHECK_NEAR(r.f, 1, 1e-12);
}

/* The last pair is kept whatever is asked for; it does for a quadratic, in more steps. */
static void lbfgs_of_one_pair(void) {
    double f[3];
    for (int m = -1; m <= 1; m++) {
        told             t = told_make(N);
        optimise_options o = optimise_default();
        double           p[N];
        for (int i = 0; i < N; i++) p[i] = -3 + i;
        o.memory = m, o.iterations = 400, o.slope = 1e-6, o.change = 0;
        f[m + 1] = optimise_lbfgs(N, p, bowl, &t, &o).f;
        CHECK_NEAR(f[m + 1], 1, 1e-10);
    }
    CHECK(memcmp(f, f + 2, sizeof *f) == 0 && memcmp(f + 1, f + 2, sizeof *f) == 0);
}

/* The least value lies just before a wall that the first steps run into. */
static void lbfgs_wall(void) {
    told             t = told_make(N);
    optimise_options o = optimise_default();
    optimise_result  r;
    double           p[N];
    for (int i = 0; i < N; i++) p[i] = -0.95 + 0.1 * (i % 3);
    t.wall = 1, o.first = 50, o.most = 100, o.slope = 1e-7, o.change = 0;
    r = optimise_lbfgs(N, p, bowl, &t, &o);
    CHECK(r.end == OPTIMISE_SLOPE && t.bad > 0 && r.failed == t.bad);
    for (int i = 0; i < N; i++) CHECK_NEAR(p[i], 0.9, 1e-7);
    for (int i = 0; i < N; i++) p[i] = 2;
    r = optimise_lbfgs(N, p, bowl, &t, &o);                 /* begins where runs fail          */
    CHECK(r.end == OPTIMISE_STUCK && r.runs == 1 && p[0] == 2 && !(r.f < HUGE_VAL));
}

/* Values that are right to 1e-7 only: it ends there, in few runs, and is not led astray. */
static void lbfgs_noise(void) {
    told             t = told_make(N);
    optimise_options o = optimise_default();
    optimise_result  r;
    double           p[N];
    for (int i = 0; i < N; i++) p[i] = -3 + i;
    t.noise = 1e-7, o.change = 1e-6;
    r = optimise_lbfgs(N, p, bowl, &t, &o);
    CHECK(r.end != OPTIMISE_ITERATIONS && r.runs < 80);
    CHECK_NEAR(r.f, 1, 1e-5);
}

/* A value that jumps at every twentieth says nothing of its gradient: Adam follows the latter. */
static void adam_jumps(void) {
    told             t = told_make(2);
    optimise_options o = optimise_default();
    optimise_result  r;
    double           p[2] = {-3, 2};
    o.first = 0.05, o.iterations = 400;
    r = optimise_adam(2, p, bowl, &t, &o);
    CHECK(r.runs == 400 && r.end == OPTIMISE_ITERATIONS);
    CHECK_NEAR(p[0], 0.9, 0.01);
    CHECK_NEAR(p[1], 0.9, 0.01);
    t.wall = 3.5, p[0] = -3.4, p[1] = 3.4, o.first = 0.5;   /* swings into the wall            */
    r = optimise_adam(2, p, bowl, &t, &o);
    CHECK(r.failed == t.bad && r.end == OPTIMISE_ITERATIONS);
    CHECK_NEAR(r.f, 1, 1e-2);
    p[0] = 9;
    r = optimise_adam(2, p, bowl, &t, &o);
    CHECK(r.end == OPTIMISE_STUCK && r.runs == 1 && p[0] == 9);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(lbfgs_valley);
    RUN(lbfgs_scales);
    RUN(lbfgs_of_one_pair);
    RUN(lbfgs_wall);
    RUN(lbfgs_noise);
    RUN(adam_jumps);
    return TEST_END();
}
