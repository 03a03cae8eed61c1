/* free_fall.c - a sheet falls as its integrator's formula says, undeformed, damped or not.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/free_fall.c -lm
 *
 *   implicit Euler  v_n = -g h n   y_n = -g h^2 n (n+1)/2
 *   BDF2            v_n = -g h n   y_n = -g h^2 (n^2/2 + 3/4 (1 - 3^-n)): its first step is one of
 *                                  implicit Euler, half a g h^2 too low, which decays like 3^-n
 *                                  towards 3/4
 *   leapfrog        v_n = -g h n   y_n = -g h^2 n^2/2, whatever the substeps */
#include "../../clothsim.h"

#include "../test.h"
#include "../dynamics.h"

#define G     9.81
#define STEPS 50

/* A draped, damped sheet with hinges, thrown with (0.7, 0.4, -0.2) m/s: largest difference from
 * the formula over 1 m and the distance fallen, and largest change of the shape in m. */
static void fall(cloth_integrator integrator, double h, double damping, double *worst,
                 double *shape) {
    static const double v0[3] = {0.7, 0.4, -0.2};
    dyn     d;
    double *x0, *v;
    int     i, k, n;
    dyn_sheet(&d, CLOTH_SHEET_EQUILATERAL, 5, 6, 0.4, 0.4);
    x0 = d.mesh->x;
    v = dyn_copy(x0, 3 * (size_t)d.nv);
    for (i = 0; i < d.nv; i++) {            /* curved at rest: hinge angles are not 0 */
        x0[3 * i + 2] = 0.1 * sin(6 * x0[3 * i]);
        for (k = 0; k < 3; k++) v[3 * i + k] = v0[k];
    }
    d.desc.gravity[1] = -G;
    d.desc.bend = CLOTH_BEND_HINGE;
    d.desc.material.bending = 1e-4;
    d.desc.material.damping = damping;
    d.desc.integrator = integrator;
    d.desc.v = v;
    d.desc.tolerance = 1e-12;
    d.desc.cg_tolerance = 1e-12;
    *worst = *shape = 0;
    if (dyn_start(&d)) {
        for (n = 1; n <= STEPS; n++) {
            const double q = integrator == CLOTH_INTEGRATOR_EULER  ? 0.5 * n * (n + 1)
                             : integrator == CLOTH_INTEGRATOR_BDF2 ? 0.5 * n * n + 0.75
                                                                         - 0.75 * pow(3, -n)
                                                                   : 0.5 * n * n;
            const double scale = G * h * h * q;
            CHECK(cloth_step(d.sim, h, NULL) == CLOTH_OK);
            for (i = 0; i < 3 * d.nv; i++) {
                const double fell = i % 3 == 1 ? -G * h * h * q : 0;
                const double x = x0[i] + v0[i % 3] * h * n + fell;
                const double u = v0[i % 3] - (i % 3 == 1 ? G * h * n : 0);
                *worst = fmax(*worst, fabs(d.state->x[i] - x) / (scale + 1));
                *worst = fmax(*worst, fabs(d.state->v[i] - u) * h / (scale + 1));
                *shape = fmax(*shape, fabs((d.state->x[i] - x0[i])
                                           - (d.state->x[i % 3] - x0[i % 3])));
            }
        }
        CHECK_NEAR(d.state->t, STEPS * h, 1e-12);
    }
    free(v);
    dyn_end(&d);
}

static void sweep(cloth_integrator integrator, const char *name, double tolerance) {
    static const double h[] = {1e-4, 1e-3, 1.0 / 60, 0.1};
    int k, damped;
    for (k = 0; k < 4; k++)
        for (damped = 0; damped < 2; damped++) {
            double worst, shape;
            fall(integrator, h[k], damped ? 0.02 : 0, &worst, &shape);
            printf("  %-14s h = %-8.2g %-8s worst %.1e, shape %.1e m\n", name, h[k],
                   damped ? "damped" : "undamped", worst, shape);
            CHECK(worst <= tolerance);
            CHECK(shape <= 1e-12);
        }
}

static void euler(void) { sweep(CLOTH_INTEGRATOR_EULER, "implicit Euler", 1e-12); }
static void bdf2(void) { sweep(CLOTH_INTEGRATOR_BDF2, "BDF2", 1e-12); }
static void leapfrog(void) { sweep(CLOTH_INTEGRATOR_LEAPFROG, "leapfrog", 1e-12); }

/* At the default tolerances the fall is as exact: the starting guess is right but for gravity. */
static void default_tolerance(void) {
    dyn    d;
    double worst = 0;
    int    i, n;
    dyn_sheet(&d, CLOTH_SHEET_ALTERNATING, 9, 9, 1, 1);
    d.desc.gravity[1] = -G;
    if (dyn_start(&d)) {
        for (n = 0; n < 60; n++) CHECK(cloth_step(d.sim, 1.0 / 60, NULL) == CLOTH_OK);
        for (i = 0; i < d.nv; i++)
            worst = fmax(worst, fabs(d.state->x[3 * i + 1] - d.mesh->x[3 * i + 1]
                                     + G / 3600 * 0.5 * 60 * 61));
    }
    printf("  default tolerances: worst %.1e m after %.2f m\n", worst, G / 3600 * 0.5 * 60 * 61);
    CHECK(worst <= 60 * CLOTH_DEFAULT_TOLERANCE);
    dyn_end(&d);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(euler);
    RUN(bdf2);
    RUN(leapfrog);
    RUN(default_tolerance);
    return TEST_END();
}
