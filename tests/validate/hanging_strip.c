/* hanging_strip.c - a strip hangs from its top edge and stretches under its own weight.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. \
 *      validate/hanging_strip.c -lm
 *
 *   l (l^2 - 1)/2 = q (1 - s)      stretch l at s, q = rho g L/(Y h), Poisson's ratio 0
 *
 * With masses that follow the width a vertex serves, the rows of a structured mesh are a chain of
 * n segments, l_i from q (n - i - 1/2)/n. With a third of each triangle to its corners the ends of
 * a row carry 1/3 and 2/3 of what a middle vertex does, not 1/2: an error of order 1/n^2. */
#include "statics.h"

typedef struct row { double q, length, chain[3]; } row;
static const row rows[] = {                 /* continuum; chain of n = 4, 8, 16                */
    {0.001, 1.00049950099738, {1.00049950877877, 1.00049950294273, 1.00049950148372}},
    {0.01, 1.00495097452411, {1.00495172581791, 1.00495116235013, 1.00495102148078}},
    {0.1, 1.04579768541653, {1.04585389603837, 1.04581175193419, 1.04580120291647}},
    {0.5, 1.18225788449523, {1.18293677593018, 1.18242990967252, 1.18230104640100}},
};

/* The strip hangs along +z from its row z = 0. Yh = 1, L = 1, rho = 1. No bending: nothing but
 * tension holds it straight. Length of the middle of its last row; *spread: its own height. */
static double hang(cloth_sheet_pattern pattern, int nx, int n, double q, int given,
                   double *spread) {
    const int    ny = n + 1;
    const double width = 0.5;
    double      *mass = NULL, length = 0, low = 1e300, high = -1e300;
    int          i, j;
    scene        s;
    scene_sheet(&s, pattern, nx, ny, width, 1);
    scene_material(&s, 1, 1, 0, 0);
    s.desc.bend = CLOTH_BEND_NONE;
    s.desc.gravity[2] = q;
    s.desc.tolerance = 1e-12;
    if (given) {
        mass = (double *)calloc((size_t)s.mesh->nv, sizeof *mass);
        for (j = 0; j < ny; j++)
            for (i = 0; i < nx; i++)
                mass[j * nx + i] = width / (nx - 1) / n * (i == 0 || i == nx - 1 ? 0.5 : 1)
                                   * (j == 0 || j == n ? 0.5 : 1);
        s.desc.vertex_mass = mass;
    }
    for (i = 0; i < nx; i++) scene_pin(&s, i, CLOTH_AXIS_ALL);
    if (scene_start(&s) && scene_solve(&s))
        for (i = 0; i < nx; i++) {
            const double z = scene_x(&s)[3 * (n * nx + i) + 2];
            length += z * (i == 0 || i == nx - 1 ? 0.5 : 1) / (nx - 1);
            low = fmin(low, z);
            high = fmax(high, z);
        }
    *spread = high - low;
    scene_end(&s);
    free(mass);
    return length;
}

static void against_the_chain(void) {
    const table  t = table_read("refdata/hanging_strip.csv");
    table        own = t;
    const int    count = t.rows ? t.rows : (int)(sizeof rows / sizeof *rows);
    int          k, c;
    printf("       q   n        length         chain     error   spread\n");
    for (k = 0; k < count; k++)
        for (c = 0; c < (t.rows ? 5 : 3); c++) {
            const double q = t.rows ? t.at[k * t.columns] : rows[k].q;
            const double ref = t.rows ? t.at[k * t.columns + 5 + c] : rows[k].chain[c];
            double       spread, length;
            const int    n = 4 << c;
            if (!test_full() && n > 16) continue;
            length = hang(CLOTH_SHEET_DIAGONAL, 3, n, q, 1, &spread);
            printf("  %6.4g %3d %.11f %.11f %9.1e %8.1e\n", q, n, length, ref, length - ref,
                   spread);
            CHECK_NEAR(length, ref, 1e-9);
            CHECK(spread <= 1e-9);
        }
    table_free(&own);
}

/* Masses by thirds, the middle of the last row: order 2 to the continuum. */
static void default_masses(void) {
    static const struct { cloth_sheet_pattern pattern; const char *name; } mesh[] = {
        {CLOTH_SHEET_DIAGONAL, "one diagonal"}, {CLOTH_SHEET_ALTERNATING, "alternating"},
    };
    int m, k, c;
    printf("       q  mesh            n        length     continuum     error  order\n");
    for (m = 0; m < 2; m++)
        for (k = 0; k < (int)(sizeof rows / sizeof *rows); k++) {
            double last = 0;
            for (c = 0; c < 3; c++) {
                const int n = 8 << c;
                double    spread;
                double    e = hang(mesh[m].pattern, n / 2 + 1, n, rows[k].q, 0, &spread)
                           - rows[k].length;
                printf("  %6.4g  %-12s  %3d  %.10f  %.10f %9.1e", rows[k].q, mesh[m].name, n,
                       e + rows[k].length, rows[k].length, e);
                if (c) printf("   %.2f", order_of(last, e));
                printf("\n");
                if (c == 2) CHECK(order_of(last, e) > 1.85 && order_of(last, e) < 2.1);
                if (c == 2) CHECK(fabs(e) <= 1.5e-4 * rows[k].q * rows[k].q);
                last = e;
            }
        }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(against_the_chain);
    RUN(default_masses);
    return TEST_END();
}
