/* rotor.c - a stiff triangle that spins freely under implicit Euler: the turn of each step against
 * refdata/rotor_implicit_euler.csv and the recurrence
 *   dphi_(n+1) = atan(sin dphi_n / (2 - cos dphi_n)),  L_n / L_0 = sin dphi_n / sin dphi_0
 * (x^(n+1) lies on the circle in the direction of y = 2 x^n - x^(n-1)).
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/rotor.c -lm */
#include "../../clothsim.h"

#include "../test.h"
#include "../dynamics.h"

#define STEPS 200

/* turn, L [STEPS + 1]: angle of step n, angular momentum over that at the start; phi: angle before
 * the step. The first velocity is the chord of an earlier step by dphi. */
static void spin(double dphi, double stiffness, double *turn, double *L, double *phi) {
    const double h = 0.01, r3 = sqrt(3.0) / 2;
    const double rest[9] = {1, 0, 0, -0.5, r3, 0, -0.5, -r3, 0};
    const int    face[3] = {0, 1, 2};
    cloth_desc   d = cloth_desc_default();
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_state *s;
    double       L0 = 0;
    int          i, n;
    d.nv = 3;
    d.x_rest = rest;
    d.nf = 1;
    d.faces = face;
    d.gravity[1] = 0;
    d.material.density = 1;
    d.material.membrane = stiffness / (h * h);
    d.tolerance = 1e-13;
    d.cg_tolerance = 1e-12;
    CHECK(cloth_model_create(&d, &model) == CLOTH_OK && cloth_sim_create(model, &sim) == CLOTH_OK);
    s = cloth_sim_state(sim);
    for (i = 0; i < 3; i++) {
        const double c = cos(dphi), q = sin(dphi);
        s->v[3 * i] = (rest[3 * i] - (c * rest[3 * i] + q * rest[3 * i + 1])) / h;
        s->v[3 * i + 1] = (rest[3 * i + 1] - (-q * rest[3 * i] + c * rest[3 * i + 1])) / h;
    }
    cloth_sim_state_changed(sim);
    turn[0] = dphi;
    phi[0] = 0;
    for (n = 0; n <= STEPS; n++) {
        const double x = s->x[0], y = s->x[1];
        double       a = 0;
        if (n > 0) {
            CHECK(cloth_step(sim, h, NULL) == CLOTH_OK);
            turn[n] = atan2(x * s->x[1] - y * s->x[0], x * s->x[0] + y * s->x[1]);
            phi[n] = phi[n - 1] + turn[n - 1];
        }
        for (i = 0; i < 3; i++)
            a += s->x[3 * i] * s->v[3 * i + 1] - s->x[3 * i + 1] * s->v[3 * i];
        if (n == 0) L0 = a;
        L[n] = a / L0;
    }
    cloth_sim_destroy(sim);
    cloth_model_destroy(model);
}

/* The rotor without strain: the strain, dphi^2 rho r^2/(h^2 Y) about 1e-6, is the error, a power
 * series in 1/Y because implicit Euler damps the radial motion at once; Y, 2 Y and 4 Y give its
 * limit. (A much stiffer rotor would be solved along a curved valley, 1e-4 of a turn at a time.) */
static void run(double dphi, double *turn, double *L, double *phi) {
    double a[3][3][STEPS + 1];
    int    k, n;
    for (k = 0; k < 3; k++)
        spin(dphi, (1 << k) * (1e4 + 1e6 * dphi * dphi), a[k][0], a[k][1], a[k][2]);
    for (n = 0; n <= STEPS; n++) {
        double b[3];
        for (k = 0; k < 3; k++)
            b[k] = a[0][k][n] / 3 - 2 * a[1][k][n] + 8 * a[2][k][n] / 3;
        turn[n] = b[0];
        L[n] = b[1];
        phi[n] = b[2];
    }
}

static void recurrence(void) {
    static const double start[] = {0.001, 0.01, 0.05, 0.1, 0.3, 0.5, 1.0};
    double turn[STEPS + 1], L[STEPS + 1], phi[STEPS + 1], worst = 0;
    int    k, n;
    for (k = 0; k < (int)(sizeof start / sizeof *start); k++) {
        double a = start[k];
        run(a, turn, L, phi);
        for (n = 1; n <= STEPS; n++) {
            a = atan(sin(a) / (2 - cos(a)));
            worst = fmax(worst, fabs(turn[n] - a));
            worst = fmax(worst, fabs(L[n] - sin(a) / sin(start[k])));
        }
    }
    printf("  worst difference from the recurrence %.1e\n", worst);
    CHECK(worst <= 1e-9);
}

static void table(void) {
    FILE  *f = dyn_table("refdata/rotor_implicit_euler.csv");
    double row[5], turn[STEPS + 1], L[STEPS + 1], phi[STEPS + 1], start = -1, worst = 0;
    int    rows = 0;
    if (!f) SKIP("no refdata/rotor_implicit_euler.csv");
    printf("  dphi_0  step  L/L0 ours       reference\n");
    while (dyn_csv(f, row, 5, NULL)) {
        const int n = (int)row[1];
        if (!(fabs(row[0] - start) <= 0)) {
            start = row[0];
            run(start, turn, L, phi);
        }
        rows++;
        CHECK_NEAR(turn[n], row[2], 1e-9);
        CHECK_NEAR(L[n], row[3], 1e-9);
        CHECK_NEAR(phi[n], row[4], 1e-9);
        worst = fmax(worst, fmax(fabs(turn[n] - row[2]), fabs(L[n] - row[3])));
        if (n == 200) printf("  %5.3f   %4d  %.12f  %.12f\n", start, n, L[n], row[3]);
    }
    fclose(f);
    printf("  worst difference from the table %.1e\n", worst);
    CHECK(rows >= 54);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(recurrence);
    RUN(table);
    return TEST_END();
}
