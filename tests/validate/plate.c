/* plate.c - square plates under an even load: what hinges make of Kirchhoff's plate.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. validate/plate.c -lm
 *
 *   simply supported  w = 0.00406235266 q a^4/D,   clamped  w = 0.00126531909 q a^4/D
 *
 * Neither depends on Poisson's ratio, so a sheet of hinges can reach both - if its rigidity is the
 * same in all directions, which holds on the equilateral lattice alone. On right triangles the
 * deflection tends to another number; this program holds the kit to the numbers known for its
 * formula (within 0.2 %: they have three digits), so that no error of 1 % passes unseen. The
 * clamp is an extra fixed row outside, full first hinge: too soft as 1/n. */
#include "statics.h"

static const double pi = 3.14159265358979323846;

/* Deflection of a simply supported b x c plate at (x, y): Navier's series, q = D = 1. */
static double navier(double b, double c, double x, double y) {
    double sum = 0;
    int    m, n;
    for (m = 1; m < 200; m += 2)
        for (n = 1; n < 200; n += 2) {
            const double k = m * m / (b * b) + n * n / (c * c);
            sum += 16 / (pi * pi * pi * pi * pi * pi * m * n * k * k) * sin(m * pi * x / b)
                   * sin(n * pi * y / c);
        }
    return sum;
}

/* The sheet's plane is held still (y alone is free), the load is its weight: q = 1e-3, D = 1, so
 * that w is 1e-6 and membrane stress (Y h = 1) below 1e-11 of the load. Cells outside the plate
 * on each side: `ring`. Returns w D/(q W^4) over its reference, W x H the plate. */
static double deflection(cloth_sheet_pattern pattern, int n, int rows, int ring) {
    const double q = 1e-3, l = 1.0 / n;
    const int    equilateral = pattern == CLOTH_SHEET_EQUILATERAL;
    const double tall = equilateral ? l * sqrt(0.75) : l, H = rows * tall;
    double       w = 0, ratio = 0, best = 1e300;
    int          i, at = 0;
    scene        s;
    scene_sheet(&s, pattern, n + 1 + 2 * ring, rows + 1 + 2 * ring, 1 + 2 * ring * l,
                H + 2 * ring * tall);
    scene_material(&s, 1, 1, 0, 1);
    s.desc.gravity[1] = -q;
    s.desc.tolerance = 1e-13;
    for (i = 0; i < s.mesh->nv; i++) {
        const double x = s.mesh->x[3 * i] - ring * l, z = s.mesh->x[3 * i + 2] - ring * tall;
        const int    rim = x < 1e-9 || x > 1 - 1e-9 || z < 1e-9 || z > H - 1e-9;
        const double r = fabs(x - 0.5) + 2 * fabs(z - 0.5 * H);
        scene_pin(&s, i, CLOTH_AXIS_X | CLOTH_AXIS_Z | (rim ? CLOTH_AXIS_Y : 0u));
        if (r < best - 1e-9) {
            best = r;
            at = i;
        }
    }
    if (scene_start(&s) && scene_solve(&s)) {
        const double x = s.mesh->x[3 * at] - ring * l, z = s.mesh->x[3 * at + 2] - ring * tall;
        w = -scene_x(&s)[3 * at + 1] / q;
        if (ring) {                         /* to the middle of two vertices; to a square      */
            const double *y = scene_x(&s) + 3 * at + 1;
            if (fabs(x - 0.5) > 1e-9) w = -(9 * (y[0] + y[3]) - (y[-3] + y[6])) / 16 / q;
            ratio = w / (0.00126531909 * H * H);
        } else
            ratio = w / navier(1, H, x, z);
    }
    scene_end(&s);
    return ratio;
}

typedef struct line {
    const char         *name;
    cloth_sheet_pattern pattern;
    int                 ring;               /* 0: simply supported, 1: clamped                 */
    double              want[4];            /* n = 8, 16, 32, 64                               */
} line;

static void right_triangles(void) {
    static const line lines[] = {
        {"one diagonal", CLOTH_SHEET_DIAGONAL, 0, {0.576, 0.562, 0.557, 0.556}},
        {"alternating", CLOTH_SHEET_ALTERNATING, 0, {0.756, 0.747, 0.745, 0.744}},
        {"one diagonal", CLOTH_SHEET_DIAGONAL, 1, {1.091, 0.921, 0.832, 0.787}},
        {"alternating", CLOTH_SHEET_ALTERNATING, 1, {1.323, 1.127, 1.032, 0.986}},
    };
    int k, c;
    printf("  deflection over Kirchhoff's        n    ours     known    error\n");
    for (k = 0; k < 4; k++)
        for (c = 0; c < (test_full() ? 4 : 3); c++) {
            const int n = 8 << c;
            double    r = deflection(lines[k].pattern, n, n, lines[k].ring);
            printf("  %-16s %-14s %4d  %.4f    %.3f  %8.1e\n",
                   lines[k].ring ? "clamped" : "simply supported", lines[k].name, n, r,
                   lines[k].want[c], r / lines[k].want[c] - 1);
            CHECK_REL(r, lines[k].want[c], 0.002);
        }
}

/* 15 rows of equilateral triangles on 13 edges make a rectangle 0.9993 high. */
static void equilateral(void) {
    int k, c;
    printf("  deflection over Kirchhoff's        n    ours    1 - ours  order\n");
    for (k = 0; k < 2; k++) {
        double last = 0, r = 0, before = 0;
        for (c = 1; c < (test_full() ? 8 : 4); c *= 2) {
            before = r;
            r = deflection(CLOTH_SHEET_EQUILATERAL, 13 * c, 15 * c, k);
            printf("  %-16s %-14s %4d  %.4f  %9.1e", k ? "clamped" : "simply supported",
                   "equilateral", 13 * c, r, 1 - r);
            if (c > 1) printf("  %.2f", order_of(last, 1 - r));
            if (c > 1) CHECK(order_of(last, 1 - r) > 0.7 && order_of(last, 1 - r) < 1.3);
            printf("\n");
            last = 1 - r;
        }
        printf("  %-16s %-14s  inf  %.4f\n", k ? "clamped" : "simply supported", "equilateral",
               2 * r - before);
        CHECK_NEAR(2 * r - before, 1, 0.006);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(right_triangles);
    RUN(equilateral);
    return TEST_END();
}
