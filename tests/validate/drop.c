/* drop.c - one triangle, a strip and a sheet fall on a plane: none rebounds.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/drop.c -lm
 *
 * The rebound is how far the centre of mass rises above the contact thickness t after its lowest
 * point, over the drop; an elastic ball has 1. Below t it is still in contact: an impact goes
 * deeper (leapfrog to a row's bound of t/4), from where the potential lets it up to where its
 * weight is carried (printed as settles). */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

static const char *const shape_name[] = {"triangle", "strip", "sheet"};

/* Rebound over the drop; *low: smallest height of a vertex. */
static double rebound(int shape, cloth_integrator integrator, double h, double drop, double *low,
                      double *settle) {
    static const int triangle[3] = {0, 2, 1};
    double           least = INFINITY, up = 0, y, seconds = sqrt(2 * drop / FRIC_G) + 0.5;
    fric             s;
    int              i, k;
    fric_sheet(&s, shape == 2 ? 9 : 2, shape == 2 ? 9 : shape ? 17 : 2,
               shape == 2 ? 0.2 : 0.02, shape ? 0.2 : 0.02);
    if (shape == 0) s.desc.nv = s.nv = 3, s.desc.nf = 1, s.desc.faces = triangle;
    fric_place(&s, 0, 0, FRIC_T + drop, 0);
    s.desc.integrator = integrator;
    *low = INFINITY;
    *settle = 0;
    if (!fric_start(&s) || !CHECK(fric_ground(&s, 0, 0.3, 0, 0) == CLOTH_OK)) goto done;
    for (i = 0; i < seconds / h; i++) {
        const double *x = cloth_sim_state(s.sim)->x;
        CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
        y = fric_mean(&s, x, 1);
        least = fmin(least, y);
        *settle = fmax(*settle, y - least);
        if (y > least) up = fmax(up, y - FRIC_T);
        for (k = 0; k < s.nv; k++) *low = fmin(*low, x[3 * k + 1]);
    }
done:
    fric_end(&s);
    return up / drop;
}

static void dropped(void) {
    static const cloth_integrator integrator[] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                                  CLOTH_INTEGRATOR_LEAPFROG};
    static const char *const name[] = {"EULER", "BDF2", "LEAPFROG"};
    static const double      drops[] = {0.05, 0.5};
    int                      shape, i, k;
    printf("  shape     integrator  drop m   rebound / drop  bound  lowest / t  settles / t\n");
    for (shape = 0; shape < 3; shape++)
        for (i = 0; i < 3; i++)
            for (k = 0; k < 2; k++) {
                const double h = i == 2 ? 1.0 / 480 : 1.0 / 60;
                double       low, settle;
                const double part = rebound(shape, integrator[i], h, drops[k], &low, &settle);
                printf("  %-9s %-9s %8.2f   %12.2e    0.01  %.3f       %.3f\n", shape_name[shape],
                       name[i], drops[k], part, low / FRIC_T, settle / FRIC_T);
                CHECK(part <= 0.01);
                CHECK(low > 0);
            }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(dropped);
    return TEST_END();
}
