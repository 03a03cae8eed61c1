/* lateral_buckling.c - a plate held by one end, its plane upright: when does its weight tip it?
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. -DCLOTHSIM_IMPLEMENTATION \
 *      validate/lateral_buckling.c -lm -o lateral_buckling && ./lateral_buckling
 *
 * Gamma = rho g L^3/D at the threshold, by width over length. Twist decides here, so Poisson's
 * ratio does: that of hinges is -1/3 on the equilateral lattice whatever the material says, and
 * its threshold is above that of an isotropic plate: 1.33 times nu = 0.3 at width 0.1, 1.12 times
 * at width 1 (homogenised lattice). This is the limit of hinge bending to know about.
 *
 * Method: a small sideways force at the tip; its stiffness k(Gamma) is even in Gamma and falls to
 * zero at the threshold: secants in Gamma^2 from below, every solve a stable equilibrium. */
#include "statics.h"

/* Ritz, width over length, nu = 0, nu = 0.3. */
static const double ritz[][3] = {
    {0.05, 18.74875, 15.06507}, {0.1, 19.34918, 15.66922}, {0.2, 20.64199, 16.99927},
    {0.3, 22.02548, 18.45356},  {0.5, 24.96338, 21.59569}, {0.75, 28.77480, 25.72704},
    {1.0, 32.51605, 29.81885},  {1.5, 38.48208, 36.04983},
};

#define POINTS 5

/* t at k = 0 of the polynomial t(k) through the points (Neville). */
static double at_zero(int n, const double *k, const double *t) {
    double p[POINTS];
    int    i, j;
    for (i = 0; i < n; i++) p[i] = t[i];
    for (j = 1; j < n; j++)
        for (i = 0; i < n - j; i++)
            p[i] = (k[i + j] * p[i] - k[i] * p[i + 1]) / (k[i + j] - k[i]);
    return p[0];
}

/* The strip along x, gravity along +z. Pinned over the first a; the length begins half an edge
 * before that (see elastica.c: wide_sheet). Returns Gamma at the threshold; *change: what the
 * last point did to it. */
static double threshold(int n, int rows, double *width, double *change) {
    const double a = 1 / (n + 0.5), F = 1e-6;
    double       t[POINTS], k[POINTS], zero = 0, before = 0, *force;
    int          i, step, count = 0, good;
    scene        s;
    *width = rows * a * sqrt(0.75);
    scene_sheet(&s, CLOTH_SHEET_EQUILATERAL, n + 2, rows + 1, (n + 1) * a, *width);
    scene_material(&s, 1, 1e6, 0.3, 1);
    s.desc.tolerance = 1e-12;
    force = (double *)calloc(3 * (size_t)s.mesh->nv, sizeof *force);
    for (i = 0; i < s.mesh->nv; i++) {
        if (s.mesh->x[3 * i] < 1.01 * a) scene_pin(&s, i, CLOTH_AXIS_ALL);
        if (s.mesh->x[3 * i] > (n + 0.99) * a) {
            force[3 * i + 1] = F;
            count++;
        }
    }
    good = scene_start(&s) && cloth_sim_set_force(s.sim, force) == CLOTH_OK;
    for (step = 0; good && step < POINTS; step++) {
        double g[3] = {0, 0, 0}, w = 0;
        t[step] = step == 0 ? 64 : step == 1 ? 144 : t[step - 1] + 0.6 * (zero - t[step - 1]);
        g[2] = sqrt(t[step]);
        CHECK(cloth_sim_set_gravity(s.sim, g) == CLOTH_OK);
        good = scene_solve(&s);
        for (i = 0; i < s.mesh->nv; i++)
            if (force[3 * i + 1] > 0) w += scene_x(&s)[3 * i + 1] / count;
        k[step] = F * count / w;
        before = zero;
        if (step > 0) zero = at_zero(step + 1, k, t);
    }
    scene_end(&s);
    free(force);
    *change = sqrt(before / zero) - 1;
    return good ? sqrt(zero) : 0;
}

/* Ritz at a width between two of the table's. */
static double plate(double width, int nu) {
    const int count = (int)(sizeof ritz / sizeof *ritz);
    int       k = 1;
    double    f;
    while (k < count - 1 && ritz[k][0] < width) k++;
    f = (width - ritz[k - 1][0]) / (ritz[k][0] - ritz[k - 1][0]);
    return ritz[k - 1][1 + nu] + f * (ritz[k][1 + nu] - ritz[k - 1][1 + nu]);
}

/* known: ratio to nu = 0.3 of the homogenised lattice. */
static void thresholds(void) {
    static const struct { int n, rows; double known; } mesh[] = {
        {34, 4, 1.33}, {69, 8, 1.33}, {20, 12, 0}, {41, 24, 0}, {20, 24, 1.12}, {41, 48, 1.12},
    };
    const int count = (int)(sizeof mesh / sizeof *mesh);
    double    coarse = 0;
    int       k;
    printf("  width/L    mesh    Gamma     last step  over nu = 0.3  (lattice)  over nu = 0\n");
    for (k = 0; k < count; k++) {
        double w, change, g;
        if (!test_full() && k % 2) continue;
        g = threshold(mesh[k].n, mesh[k].rows, &w, &change);
        printf("  %.4f  %3d x %-2d  %8.4f  %8.1e       %.3f", w, mesh[k].n, mesh[k].rows, g, change,
               g / plate(w, 1));
        if (mesh[k].known > 0) printf("       %.2f", mesh[k].known);
        else printf("           ");
        printf("       %.3f\n", g / plate(w, 0));
        CHECK(fabs(change) <= 2e-3);
        if (mesh[k].known > 0) CHECK_REL(g / plate(w, 1), mesh[k].known, 0.025);
        if (k % 2) {                        /* edge rows: an error of order 1 in 1/rows        */
            const double limit = 2 * g / plate(w, 1) - coarse;
            printf("             in the limit                  %.3f\n", limit);
            if (mesh[k].known > 0) CHECK_REL(limit, mesh[k].known, 0.007);
        }
        coarse = g / plate(w, 1);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(thresholds);
    return TEST_END();
}
