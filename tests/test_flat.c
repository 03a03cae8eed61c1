/* test_flat.c - triangles pressed flat: the resistance against differences, and steps that end.
 *   cc -std=c99 -O2 -ffp-contract=off -I. test_flat.c -lm
 */
#define CLOTHSIM_IMPLEMENTATION
#include "../clothsim_collide.h"

#include "test.h"

/* --- differences --- */

/* A triangle with `part` of the area of flat_twice, in no plane of the axes. */
static const double flat_twice = 0.02 * 0.03;

static void flat_pose(double part, double *x) {
    static const double u[3] = {0.6, 0.48, 0.64}, v[3] = {-0.8, 0.36, 0.48};
    int                 k;
    for (k = 0; k < 3; k++) {
        x[k] = 0.1 + 0.2 * k;
        x[3 + k] = x[k] + 0.022 * u[k];
        x[6 + k] = x[k] + 0.009 * u[k] + part * flat_twice / 0.022 * v[k];
    }
}

/* part: of the area below which it resists. */
static void compare(double part) {
    double x[9], y[9], g[9], g0[9], g1[9], H[81], P[81], e, scale = 0, force = 0, least = 0;
    int    i, j;
    flat_pose(part * CLOTHI_FLAT, x);
    e = clothi_flat_energy(x, flat_twice, 1, g, H, 0);
    (void)clothi_flat_energy(x, flat_twice, 1, g0, P, 1);
    CHECK(e > 0);
    for (i = 0; i < 9; i++) {
        CHECK_NEAR(g0[i], g[i], 0);
        force = fmax(force, fabs(g[i]));
    }
    for (i = 0; i < 81; i++) scale = fmax(scale, fabs(H[i]));
    for (i = 0; i < 9; i++) {
        const double step = 1e-4 * part * CLOTHI_FLAT * 0.02;
        double       e0, e1;
        memcpy(y, x, sizeof y);
        y[i] = x[i] + step, e1 = clothi_flat_energy(y, flat_twice, 1, g1, NULL, 0);
        y[i] = x[i] - step, e0 = clothi_flat_energy(y, flat_twice, 1, g0, NULL, 0);
        CHECK_NEAR(g[i], (e1 - e0) / (2 * step), 1e-4 * force);
        for (j = 0; j < 9; j++)
            CHECK_NEAR(H[9 * j + i], (g1[j] - g0[j]) / (2 * step), 1e-5 * scale);
    }
    for (j = 0; j < 400; j++) {             /* no direction in which the definite model falls */
        double d[9], sum = 0;
        for (i = 0; i < 9; i++) d[i] = sin(1.7 * j * (i + 1) + i);
        for (i = 0; i < 81; i++) sum += P[i] * d[i / 9] * d[i % 9];
        least = fmin(least, sum);
    }
    CHECK(least >= -1e-12 * scale);
}

static void differences(void) {
    compare(0.99);
    compare(0.8);
    compare(0.3);
    compare(0.01);
    compare(1e-4);
}

/* Nothing above its range, finite on the edge itself. */
static void ends(void) {
    double x[9], g[9], H[81];
    int    i;
    flat_pose(1.0001 * CLOTHI_FLAT, x);
    CHECK(!(clothi_flat_energy(x, flat_twice, 1, g, H, 0) > 0));
    flat_pose(0.9999 * CLOTHI_FLAT, x);
    CHECK(clothi_flat_energy(x, flat_twice, 1, g, H, 0) < 1e-10);
    flat_pose(0, x);
    for (i = 0; i < 3; i++) x[3 + i] = x[i];
    CHECK(clothi_flat_energy(x, flat_twice, 1, g, H, 0) < 40);
    for (i = 0; i < 81; i++) CHECK(clothi_finite(H[i]) && clothi_finite(g[i % 9]));
}

/* --- steps --- */

/* Two triangles of 50 cm^2; vertex 3 is free in their plane and pulled by f N towards the edge
 * opposite to it and beyond. In the plane bending only leaps, by pi^2 J where the triangle is flat:
 * without resistance some of these steps end on that wall. Returns the least part of the area.
 * Without impacts the forces that contact reports are what M (v - v^n)/h is more than pull and
 * stretch: *unsaid, N, the largest difference. */
static double pulled(double f, double *unsaid) {
    static const double x[12] = {0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0.1, 0, 0.1};
    static const int    faces[6] = {0, 2, 1, 1, 2, 3};
    cloth_desc     desc = cloth_desc_default();
    cloth_model   *model = NULL;
    cloth_sim     *sim = NULL;
    cloth_collide *c = NULL;
    cloth_report   r;
    double         force[12] = {0}, least = 1;
    int            k, failed = 0, most = 0;
    desc.nv = 4, desc.nf = 2, desc.faces = faces, desc.x_rest = x;
    desc.material.membrane = 100, desc.material.bending = 1;
    desc.material.damping = 0, desc.tolerance = 1e-6;
    desc.contact = CLOTH_CONTACT_SELF;
    CHECK(cloth_model_create(&desc, &model) == CLOTH_OK);
    CHECK(cloth_sim_create(model, &sim) == CLOTH_OK);
    CHECK(cloth_collide_create(sim, NULL, &c) == CLOTH_OK);
    if (!c) exit(2);
    force[9] = force[11] = -f;
    for (k = 0; k < 4; k++)
        CHECK(cloth_sim_pin(sim, k, k < 3 ? 7 : 2, x + 3 * k) == CLOTH_OK);
    CHECK(cloth_sim_set_force(sim, force) == CLOTH_OK);
    for (k = 0; k < 40; k++) {
        const double *y = cloth_sim_state(sim)->x + 9, *v = cloth_sim_state(sim)->v + 9;
        const double  v0 = v[0];
        double        own[12], g[9], mu, lambda;
        if (cloth_step(sim, 1.0 / 120, &r) != CLOTH_OK) {
            failed++;
            continue;
        }
        cloth_material_lame(&desc.material, &mu, &lambda);
        CHECK(cloth_collide_forces(c, own) == CLOTH_OK);
        (void)cloth_stretch(c->x_ie + 3, cloth_sim_params(sim)->X + 6, mu, lambda, g, NULL, 0);
        if (c->nrow == 0)
            *unsaid = fmax(*unsaid, fabs(cloth_sim_params(sim)->mass[3] * (v[0] - v0) * 120 -
                                         (force[9] - g[6] + own[9])));
        most = r.newton > most ? r.newton : most;
        least = fmin(least, (y[0] + y[2]) / 0.1 - 1);
    }
    printf("  %4g N (%.1e not told): at most %2d iterations a step, at least %.4f of the area\n", f,
           *unsaid, most, least);
    CHECK(failed == 0);
    CHECK(most < 100);
    cloth_collide_destroy(c);
    cloth_sim_destroy(sim);
    cloth_model_destroy(model);
    return least;
}

static void pressed(void) {
    static const double f[6] = {0.5, 1, 2, 5, 10, 20};
    int                 i;
    for (i = 0; i < 6; i++) {
        double       unsaid = 0;
        const double least = pulled(f[i], &unsaid);
        CHECK(least > 0 && least < 1);
        CHECK_NEAR(unsaid, 0, 1e-3);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(differences);
    RUN(ends);
    RUN(pressed);
    return TEST_END();
}
