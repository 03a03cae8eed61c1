/* test_math.c - the small maths under everything else.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_math.c -lm -o test_math && ./test_math */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include <float.h>

#include "test.h"
#include "reference.h"

/* Distance of a from the exact value in units of the last place of the exact value. */
static double ulps(double a, long double exact) {
    int          e;
    const double unit = (frexp((double)exact, &e), ldexp(1.0, e - 53));
    return (double)fabsl((long double)a - exact) / (unit > DBL_MIN ? unit : DBL_MIN);
}

static void atan2_ulp(void) {
    unsigned long long seed = 1;
    double             worst = 0, at_y = 0, at_x = 0;
    const int          rounds = test_full() ? 20000000 : 500000;
    int                k;
    for (k = 0; k < rounds; k++) {
        double y, x, u;
        switch (k % 4) {
        case 0:                             /* all directions */
            y = ref_uniform(&seed, -1, 1);
            x = ref_uniform(&seed, -1, 1);
            break;
        case 1:                             /* small angles over 200 decades */
            y = ref_uniform(&seed, -1, 1) * pow(10, ref_uniform(&seed, -200, 0));
            x = ref_uniform(&seed, 0.5, 1);
            break;
        case 2:                             /* near the borders of the octants and of the turn */
            x = ref_uniform(&seed, -1, 1);
            y = (k % 8 == 2 ? 1.0 : tan(0.39269908169872415)) * x
                * (1 + ref_uniform(&seed, -1, 1) * pow(10, ref_uniform(&seed, -17, -1)));
            if (k % 3 == 0) {
                const double swap = x;
                x = y;
                y = swap;
            }
            break;
        default:                            /* any sizes */
            y = ref_uniform(&seed, -1, 1) * pow(10, ref_uniform(&seed, -150, 150));
            x = ref_uniform(&seed, -1, 1) * pow(10, ref_uniform(&seed, -150, 150));
            break;
        }
        u = ulps(clothi_atan2(y, x), atan2l((long double)y, (long double)x));
        if (!(u <= worst)) {
            worst = u;
            at_y = y;
            at_x = x;
        }
    }
    printf("  atan2: worst error %.2f ulp at (%.17g, %.17g)\n", worst, at_y, at_x);
    CHECK(worst <= 3.0);
}

static void atan2_special(void) {
    const double pi = 3.14159265358979323846;
    int          k;
    CHECK_NEAR(clothi_atan2(0, 0), 0, 0);
    CHECK_NEAR(clothi_atan2(0, 1), 0, 0);
    CHECK_NEAR(clothi_atan2(0, -1), pi, 0);
    CHECK_NEAR(clothi_atan2(-0.0, -1), -pi, 0);
    CHECK_NEAR(clothi_atan2(-DBL_MIN, -1), -pi, 0);
    CHECK_NEAR(clothi_atan2(1, 0), pi / 2, 0);
    CHECK_NEAR(clothi_atan2(-1, 0), -pi / 2, 0);
    CHECK_NEAR(clothi_atan2(1, 1), pi / 4, 0);
    CHECK_NEAR(clothi_atan2(DBL_MIN, 1), DBL_MIN, 0);
    CHECK_NEAR(clothi_atan2(1e300, 1e300), pi / 4, 0);
    for (k = 0; k <= 1000; k++) {           /* odd in y, between -pi and pi */
        const double a = -pi + 2 * pi * k / 1000.0;
        CHECK_NEAR(clothi_atan2(sin(a), cos(a)), -clothi_atan2(-sin(a), cos(a)), 0);
        CHECK(fabs(clothi_atan2(sin(a), cos(a))) <= pi);
    }
}

/* what libm answers otherwise on every platform: against it, in units of 2^-52 */
static void circle_and_log(void) {
    const long double  turn = 6.283185307179586476925286766559L;
    unsigned long long seed = 7;
    double             worst[2] = {0, 0}, c, s;
    int                k;
    for (k = -8; k <= 8; k++) {             /* the quarters themselves */
        clothi_circle(0.25 * k, &c, &s);
        CHECK_NEAR(c, k % 2 ? 0 : k % 4 ? -1 : 1, 0);
        CHECK_NEAR(s, k % 2 ? ((k & 3) == 1 ? 1 : -1) : 0, 0);
    }
    if (!test_long_double()) SKIP("long double has the bits of double here");
    for (k = 0; k < 200000; k++) {
        const double      turns = ref_uniform(&seed, -2, 2) * (k % 2 ? 1 : 500);
        const double      a = ref_uniform(&seed, 0, 1) * (k % 3 ? 1 : pow(10, -k % 12));
        const long double exact = logl((long double)a), big = fabsl(exact);
        const long double angle = turn * (long double)turns;
        clothi_circle(turns, &c, &s);
        worst[0] = fmax(worst[0], (double)fabsl((long double)c - cosl(angle)));
        worst[0] = fmax(worst[0], (double)fabsl((long double)s - sinl(angle)));
        worst[1] = fmax(worst[1], (double)(fabsl((long double)clothi_log(a) - exact) /
                                           (big > 1 ? big : 1)));
    }
    printf("  circle: worst error %.2f ulp of 1; log: %.2f\n", worst[0] / DBL_EPSILON,
           worst[1] / DBL_EPSILON);
    CHECK(worst[0] <= 2 * DBL_EPSILON && worst[1] <= 2 * DBL_EPSILON);
}

static void vectors(void) {
    const double a[3] = {1, 2, 3}, b[3] = {-4, 5, 0.5};
    double       c[3];
    CHECK_NEAR(clothi_dot3(a, b), 7.5, 0);
    clothi_cross3(a, b, c);
    CHECK(c[0] >= -14 && c[0] <= -14 && c[1] >= -12.5 && c[1] <= -12.5 && c[2] >= 13 && c[2] <= 13);
    clothi_sub3(a, b, c);
    CHECK_NEAR(c[0], 5, 0);
    CHECK_NEAR(c[1], -3, 0);
    CHECK_NEAR(c[2], 2.5, 0);
    CHECK_NEAR(clothi_max(1, 2), 2, 0);
    CHECK_NEAR(clothi_min(1, 2), 1, 0);
}

static void finite_by_bits(void) {
    double       a[4] = {0.0, -DBL_MAX, DBL_MIN / 8, 1.0};
    const double zero = a[0];
    CHECK(clothi_find_nonfinite(a, 4) == -1);
    a[2] = 1.0 / zero;
    CHECK(!clothi_finite(a[2]) && clothi_find_nonfinite(a, 4) == 2);
    clothi_settle(a, 4);
    CHECK_NEAR(fabs(a[1]) + fabs(a[2]) + fabs(a[3]), 0, 0);
    a[3] = zero / zero;
    CHECK(!clothi_finite(a[3]) && clothi_find_nonfinite(a, 4) == 3);
    clothi_settle(NULL, 4);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(atan2_ulp);
    RUN(atan2_special);
    RUN(circle_and_log);
    RUN(vectors);
    RUN(finite_by_bits);
    return TEST_END();
}
