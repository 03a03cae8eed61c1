/* oscillator.c - a triangle on springs that moves as one mass: exactly the linear oscillator, step
 * by step, against closed forms and refdata/oscillator_implicit_euler.csv.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/oscillator.c -lm
 *
 *   w = omega h.  Implicit Euler: x_n = (1 + w^2)^(-n/2) cos(n atan w), energy / (1 + w^2) a step.
 *   BDF2: every x_n = z^n with (3/2 - 2/z + 1/(2 z^2))^2 + w^2 = 0, that is
 *   (9/4 + w^2) x_n - 6 x_(n-1) + 11/2 x_(n-2) - 2 x_(n-3) + 1/4 x_(n-4) = 0. */
#include "../../clothsim.h"

#include "../test.h"
#include "../dynamics.h"

#define STEPS 100
#define OMEGA 20.0                          /* rad/s */

static const double moduli[] = {0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 10, 100};
enum { MODULI = sizeof moduli / sizeof *moduli };

/* One triangle with a spring k = m omega^2 at each corner, moved by 1 along x: it stays rigid, so
 * that the membrane has no say. x, v [STEPS + 1]: displacement, velocity over omega. */
static void run(cloth_integrator integrator, double w, double *x, double *v) {
    static const double rest[9] = {0, 0, 0, 1, 0, 0, 0.3, 0.8, 0};
    static const int    face[3] = {0, 1, 2};
    cloth_desc   d = cloth_desc_default();
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_state *state;
    int          i, n;
    d.nv = 3;
    d.x_rest = rest;
    d.nf = 1;
    d.faces = face;
    d.gravity[1] = 0;
    d.integrator = integrator;
    d.substeps = 1;
    d.material.density = 0.2;
    d.material.membrane = 10;
    d.tolerance = 1e-13;
    d.cg_tolerance = 1e-13;
    CHECK(cloth_model_create(&d, &model) == CLOTH_OK && cloth_sim_create(model, &sim) == CLOTH_OK);
    state = cloth_sim_state(sim);
    for (i = 0; i < 3; i++) {
        const double     k = cloth_sim_params(sim)->mass[i] * OMEGA * OMEGA;
        double           bary[3] = {0, 0, 0};
        cloth_attachment id;
        bary[i] = 1;
        CHECK(cloth_sim_attach(sim, 0, bary, k, rest + 3 * i, &id) == CLOTH_OK);
        state->x[3 * i] += 1;
    }
    cloth_sim_state_changed(sim);
    for (n = 0; n <= STEPS; n++) {
        x[n] = state->x[0];
        v[n] = state->v[0] / OMEGA;
        CHECK(dyn_worst(state->x + 1, rest + 1, 2) <= 1e-12);
        if (n < STEPS) CHECK(cloth_step(sim, w / OMEGA, NULL) == CLOTH_OK);
    }
    cloth_sim_destroy(sim);
    cloth_model_destroy(model);
}

static void euler_formula(void) {
    double x[STEPS + 1], v[STEPS + 1], worst = 0;
    int    k, n;
    for (k = 0; k < MODULI; k++) {
        const double w = moduli[k], q = sqrt(1 + w * w);
        run(CLOTH_INTEGRATOR_EULER, w, x, v);
        for (n = 1; n <= STEPS; n++) {
            const double r = pow(q, -n), phase = n * atan(w);
            worst = fmax(worst, fabs(x[n] - r * cos(phase)));
            worst = fmax(worst, fabs(v[n] + r * sin(phase)));
            if (w <= 1 && n <= 20)
                CHECK_REL((x[n] * x[n] + v[n] * v[n]) * (1 + w * w),
                          x[n - 1] * x[n - 1] + v[n - 1] * v[n - 1], 1e-9);
        }
    }
    printf("  implicit Euler: worst difference %.1e\n", worst);
    CHECK(worst <= 1e-9);
}

static void bdf2_formula(void) {
    double x[STEPS + 1], v[STEPS + 1], worst = 0;
    int    k, n;
    for (k = 0; k < MODULI; k++) {
        const double w = moduli[k];
        run(CLOTH_INTEGRATOR_BDF2, w, x, v);
        CHECK_NEAR(x[1], 1 / (1 + w * w), 1e-12);       /* the first step is implicit Euler */
        for (n = 5; n <= STEPS; n++) {
            const double r = (2.25 + w * w) * x[n] - 6 * x[n - 1] + 5.5 * x[n - 2]
                             - 2 * x[n - 3] + 0.25 * x[n - 4];
            worst = fmax(worst, fabs(r) / (2.25 + w * w));
        }
    }
    printf("  BDF2: worst residual of the recurrence %.1e\n", worst);
    CHECK(worst <= 1e-10);
}

/* |z| and arg z of a sequence that is c z^n + its conjugate: x_(n+1) = a x_n - b x_(n-1), b =
 * |z|^2, a = 2 |z| cos(arg z). */
static void fit(const double *x, double *size, double *angle) {
    const double det = x[1] * x[1] - x[0] * x[2];
    const double a = (x[1] * x[2] - x[0] * x[3]) / det, b = (x[2] * x[2] - x[1] * x[3]) / det;
    *size = sqrt(b);
    *angle = acos(a / (2 * *size));
}

static void table(void) {
    FILE  *f = dyn_table("refdata/oscillator_implicit_euler.csv");
    double row[10], x[STEPS + 1], v[STEPS + 1], b[STEPS + 1], bv[STEPS + 1], w = -1;
    int    rows = 0;
    if (!f) SKIP("no refdata/oscillator_implicit_euler.csv");
    printf("     w    n   x_n ours          reference        |z| BDF2 ours     reference\n");
    while (dyn_csv(f, row, 10, NULL)) {
        const int n = (int)row[1];
        double    size, angle;
        if (!(fabs(row[0] - w) <= 0)) {
            w = row[0];
            run(CLOTH_INTEGRATOR_EULER, w, x, v);
            run(CLOTH_INTEGRATOR_BDF2, w, b, bv);
        }
        rows++;
        CHECK_NEAR(x[n], row[2], 1e-9);
        CHECK_NEAR(v[n], row[3], 1e-9);
        if (w <= 10) CHECK_NEAR(x[n] * x[n] + v[n] * v[n], row[6], 1e-9);
        if (w > 1 || n != 1) continue;      /* beyond, two pairs of roots are as large */
        fit(b + 36, &size, &angle);
        CHECK_NEAR(size, row[7], 1e-9);
        CHECK_NEAR(angle / w, row[8], 1e-9 / w);
        fit(x + 4, &size, &angle);
        CHECK_NEAR(size, row[4], 1e-9);
        CHECK_NEAR(angle / w, row[5], 1e-9 / w);
        printf("  %6.2f %2d  %.12f  %.12f   %.12f    %.12f\n", w, n, x[n], row[2], size, row[7]);
    }
    fclose(f);
    CHECK(rows >= 48);
}

/* Leapfrog: x_(n+1) + x_(n-1) = (2 - w^2) x_n and v_n = (x_(n+1) - x_(n-1))/2h, that is amplitude
 * 1 for ever and 2 asin(w/2) a step. */
static void leapfrog_formula(void) {
    double x[STEPS + 1], v[STEPS + 1], worst = 0;
    int    n;
    run(CLOTH_INTEGRATOR_LEAPFROG, 0.1, x, v);
    for (n = 1; n <= STEPS; n++) {
        const double phase = 2 * n * asin(0.05);
        worst = fmax(worst, fabs(x[n] - cos(phase)));
        worst = fmax(worst, fabs(v[n] + sin(phase) * sqrt(1 - 0.0025)));
    }
    printf("  leapfrog: worst difference %.1e\n", worst);
    CHECK(worst <= 1e-11);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(euler_formula);
    RUN(bdf2_formula);
    RUN(leapfrog_formula);
    RUN(table);
    return TEST_END();
}
