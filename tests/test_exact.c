/* test_exact.c - signs of determinants against integer arithmetic.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_exact.c -lm -o test_exact && ./test_exact */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "reference.h"

/* Coordinates are multiples of unit below 2^20, moved by a corner that keeps them exact: the
 * determinant is an integer below 2^63. */
static double pick(unsigned long long *seed, int bits) {
    return floor(ref_uniform(seed, -1, 1) * ldexp(1, bits));
}

static long long det2(const double *a, const double *b, const double *c) {
    return (long long)(a[0] - c[0]) * (long long)(b[1] - c[1]) -
           (long long)(a[1] - c[1]) * (long long)(b[0] - c[0]);
}

static long long det3(const double *a, const double *b, const double *c, const double *d) {
    long long w[3][3];
    int       k;
    for (k = 0; k < 3; k++) {
        w[0][k] = (long long)(a[k] - d[k]);
        w[1][k] = (long long)(b[k] - d[k]);
        w[2][k] = (long long)(c[k] - d[k]);
    }
    return w[0][0] * (w[1][1] * w[2][2] - w[1][2] * w[2][1]) +
           w[0][1] * (w[1][2] * w[2][0] - w[1][0] * w[2][2]) +
           w[0][2] * (w[1][0] * w[2][1] - w[1][1] * w[2][0]);
}

static int sign(long long a) { return (a > 0) - (a < 0); }

/* Random points and points on or beside the line or plane of the others. */
static void against_integers(void) {
    unsigned long long seed = 1;
    int                k, i, j, zeros = 0, wrong = 0;
    for (k = 0; k < 200000; k++) {
        double       p[4][3], s = ldexp(1, k % 7 * 20 - 60);
        const double far = k % 2 ? ldexp(1, 40) : 0;
        for (i = 0; i < 4; i++)
            for (j = 0; j < 3; j++) p[i][j] = pick(&seed, k % 3 ? 18 : 3);
        if (k % 5 == 0)                     /* d in the plane: a + b - c */
            for (j = 0; j < 3; j++) p[3][j] = p[0][j] + p[1][j] - p[2][j];
        if (k % 10 == 0) p[3][k % 3] += 1;
        {
            const int three = sign(det3(p[0], p[1], p[2], p[3]));
            const int two = sign(det2(p[0], p[1], p[2]));
            for (i = 0; i < 4; i++)
                for (j = 0; j < 3; j++) p[i][j] = (p[i][j] + far) * s;
            zeros += three == 0;
            wrong += clothi_orient3d(p[0], p[1], p[2], p[3]) != three;
            wrong += clothi_orient3d(p[1], p[0], p[2], p[3]) != -three;
            wrong += clothi_turn_of(p[0], p[1], p[2], 2) != two;
            wrong += clothi_turn_of(p[1], p[0], p[2], 2) != -two;
        }
    }
    printf("  200000 tetrahedra, %d flat\n", zeros);
    CHECK(wrong == 0);
    CHECK(zeros > 1000);
}

/* One unit in the last place off the plane x + y + z = 1 and off a diagonal. */
static void one_ulp(void) {
    const double a[3] = {1, 0, 0}, b[3] = {0, 1, 0}, c[3] = {0, 0, 1};
    const double u = ldexp(1, -53);
    double       d[3] = {0.5, 0.25, 0.25}, p[2] = {12, 12}, q[2] = {24, 24}, r[2] = {0.5, 0.5};
    CHECK(clothi_orient3d(a, b, c, d) == 0);
    d[0] += 2 * u;
    CHECK(clothi_orient3d(a, b, c, d) == -1);
    d[0] = 0.5 - u;
    CHECK(clothi_orient3d(a, b, c, d) == 1);
    CHECK(clothi_turn_of(r, p, q, 2) == 0);
    r[1] += 2 * u;
    CHECK(clothi_turn_of(r, p, q, 2) == 1);
    r[1] = 0.5 - u;
    CHECK(clothi_turn_of(r, p, q, 2) == -1);
    r[0] = ldexp(1, -200);                  /* lost in the difference from p and q */
    r[1] = 0;
    CHECK(clothi_turn_of(r, p, q, 2) == -1);
    CHECK(clothi_turn_of(a, d, a, 2) == 0);
}

/* Points on a grid of one ulp around (1/2, 1/2) against the line through (12, 12), (24, 24). */
static void grid(void) {
    const double u = ldexp(1, -53), p[2] = {12, 12}, q[2] = {24, 24};
    int          i, k, wrong = 0;
    for (i = 0; i < 64; i++)
        for (k = 0; k < 64; k++) {
            double r[2];
            r[0] = 0.5 + 2 * i * u;
            r[1] = 0.5 + 2 * k * u;
            wrong += clothi_turn_of(r, p, q, 2) != (k > i) - (k < i);
            wrong += clothi_turn_of(p, q, r, 2) != (k > i) - (k < i);
            wrong += clothi_turn_of(q, r, p, 2) != (k > i) - (k < i);
        }
    CHECK(wrong == 0);
}

/* (a + b) c - a c - b c = 0 and s, r of random sums and products. */
static void expansions(void) {
    unsigned long long seed = 7;
    int                k, bad = 0;
    for (k = 0; k < 20000; k++) {
        double v[3], s[2], e[16];
        int    i, n;
        for (i = 0; i < 3; i++)
            v[i] = ref_uniform(&seed, -1, 1) * pow(10, ref_uniform(&seed, -60, 60));
        clothi_two_sum(v[0], v[1], s + 1, s);
        n = clothi_exp_add(e, 0, s, 2, v + 2, 1, 1);
        n = clothi_exp_add(e, n, v, 1, v + 2, 1, -1);
        n = clothi_exp_add(e, n, v + 2, 1, v + 1, 1, -1);
        bad += clothi_exp_sign(e, n) != 0;
        n = clothi_exp_grow(e, n, 1e-100);
        bad += clothi_exp_sign(e, n) != 1;
        clothi_two_product(v[0], v[1], s + 1, s);
        bad += s[1] != v[0] * v[1];
        bad += (long double)s[1] + (long double)s[0] != (long double)v[0] * (long double)v[1];
    }
    CHECK(bad == 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(against_integers);
    RUN(one_ulp);
    RUN(grid);
    RUN(expansions);
    return TEST_END();
}
