/* momentum.c - a free sheet that spins, drifts and wobbles keeps its linear momentum under every
 * integrator, its angular momentum under leapfrog, and loses it under implicit Euler as a rigid
 * body does (refdata/rotor_implicit_euler.csv).
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/momentum.c -lm */
#include "../../clothsim.h"

#include "../test.h"
#include "../dynamics.h"

typedef struct drift {                      /* relative, worst over the run                    */
    double linear, angular, kept;           /* kept: last L over first L                       */
} drift;

/* Spins at omega about the normal through its centre, plus a translation and, wobble > 0, a
 * velocity that bends and shears it; hinges on. */
static drift run(cloth_integrator integrator, double tolerance, double cg_tolerance,
                 double stiffness, double omega, double wobble, double h, int steps) {
    dyn     d;
    drift   out = {0, 0, 0};
    double *v, p0[3], L0[3], p[3], L[3], speed = 0, size = 0, turn = 0;
    int     i, k, n;
    dyn_sheet(&d, CLOTH_SHEET_ALTERNATING, 6, 6, 0.5, 0.5);
    v = dyn_copy(d.mesh->x, 3 * (size_t)d.nv);
    for (i = 0; i < d.nv; i++) {
        double *x = d.mesh->x + 3 * i;
        x[0] -= 0.25;
        x[1] += 0.25;
        v[3 * i] = -omega * x[1] + (wobble > 0 ? 0.3 : 0);
        v[3 * i + 1] = omega * x[0] + wobble * sin(7 * x[0]);
        v[3 * i + 2] = wobble * (x[0] * x[1] * 8 + cos(5 * x[0]));
    }
    d.desc.v = v;
    d.desc.integrator = integrator;
    d.desc.tolerance = tolerance;
    d.desc.cg_tolerance = cg_tolerance;
    d.desc.material.membrane = stiffness;
    d.desc.bend = CLOTH_BEND_HINGE;
    d.desc.material.bending = 1e-4;
    if (dyn_start(&d)) {
        dyn_momentum(&d, p0, L0);
        for (i = 0; i < d.nv; i++) {
            const double *x = d.mesh->x + 3 * i, *u = v + 3 * i;
            const double  a = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
            speed += d.mass[i] * a;
            size += d.mass[i] * a * sqrt(x[0] * x[0] + x[1] * x[1]);
        }
        turn = sqrt(L0[0] * L0[0] + L0[1] * L0[1] + L0[2] * L0[2]);
        for (n = 0; n < steps; n++) {
            cloth_report report;
            CHECK(cloth_step(d.sim, h, &report) == CLOTH_OK);
            dyn_momentum(&d, p, L);
            for (k = 0; k < 3; k++) {
                out.linear = fmax(out.linear, fabs(p[k] - p0[k]) / speed);
                out.angular = fmax(out.angular, fabs(L[k] - L0[k]) / size);
                CHECK_NEAR(report.momentum[k], p[k], 1e-12 * speed);
                CHECK_NEAR(report.angular[k], L[k], 1e-12 * (size + speed * n * h));
            }
        }
        out.kept = sqrt(L[0] * L[0] + L[1] * L[1] + L[2] * L[2]) / turn;
    }
    free(v);
    dyn_end(&d);
    return out;
}

static void say(const char *what, drift a) {
    printf("  %-44s linear %.1e  angular %.1e\n", what, a.linear, a.angular);
}

static void linear_implicit(void) {
    drift a = run(CLOTH_INTEGRATOR_EULER, 1e-10, 1e-6, 100, 5, 0.5, 0.01, 200);
    drift b = run(CLOTH_INTEGRATOR_EULER, 1e-10, 1e-2, 100, 5, 0.5, 0.01, 200);
    drift c = run(CLOTH_INTEGRATOR_BDF2, 1e-10, 1e-6, 100, 5, 0.5, 0.01, 200);
    drift e = run(CLOTH_INTEGRATOR_EULER, 1e-4, 1e-2, 100, 5, 0.5, 0.01, 200);
    say("implicit Euler, 1e-10 m, CG to 1e-6", a);
    say("implicit Euler, 1e-10 m, CG to 1e-2", b);
    say("implicit Euler, 1e-4 m, CG to 1e-2", e);
    say("BDF2, 1e-10 m, CG to 1e-6", c);
    CHECK(a.linear <= 1e-10);
    CHECK(b.linear <= 1e-8);
    CHECK(c.linear <= 1e-10);
    CHECK(e.linear <= 1e-3);
    CHECK(c.angular < 0.5 * a.angular);     /* order 2 loses less */
}

static void leapfrog(void) {
    drift a = run(CLOTH_INTEGRATOR_LEAPFROG, 1e-4, 0.1, 100, 5, 0.5, 0.01, 500);
    say("leapfrog", a);
    CHECK(a.linear <= 1e-12);
    CHECK(a.angular <= 1e-11);
}

/* A stiff sheet in its plane is the rotor: L_n/L_0 = sin a_n / sin a_0 with a_(n+1) =
 * atan(sin a_n/(2 - cos a_n)), within 5 % of the loss. */
static void angular_as_the_rotor(void) {
    static const double start[3] = {0.01, 0.05, 0.1};
    int k, n;
    for (k = 0; k < 3; k++) {
        const double h = 0.01, omega = tan(start[k]) / h;
        const int    steps = 100;
        double       a = start[k];
        drift        ours = run(CLOTH_INTEGRATOR_EULER, 1e-10, 1e-6, 1e5, omega, 0, h, steps);
        /* from v = omega x r the first step turns by atan(omega h) and keeps L over cos^2 */
        double expected;
        for (n = 1; n < steps; n++) a = atan(sin(a) / (2 - cos(a)));
        expected = sin(a) / tan(start[k]);
        printf("  omega h = %.2f: L/L0 after %d steps %.6f, rotor %.6f\n", start[k], steps,
               ours.kept, expected);
        CHECK_REL(1 - ours.kept, 1 - expected, 0.05);
    }
}

/* The table's own rows, where there is one: after the first step the turn is that of row 0. */
static void rotor_table(void) {
    FILE  *f = dyn_table("refdata/rotor_implicit_euler.csv");
    double row[5];
    if (!f) SKIP("no refdata/rotor_implicit_euler.csv");
    while (dyn_csv(f, row, 5, NULL)) {
        const int n = (int)row[1];
        drift     ours;
        if (row[0] > 0.11 || row[0] < 0.009 || (n != 50 && n != 200)) continue;
        ours = run(CLOTH_INTEGRATOR_EULER, 1e-10, 1e-6, 1e5, tan(row[0]) / 0.01, 0, 0.01, n + 1);
        printf("  dphi_0 = %.2f, step %3d: L %.6f, table %.6f\n", row[0], n,
               ours.kept / (cos(row[0])), row[3]);
        CHECK_REL(1 - ours.kept / cos(row[0]), 1 - row[3], 0.05);
    }
    fclose(f);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(linear_implicit);
    RUN(leapfrog);
    RUN(angular_as_the_rotor);
    RUN(rotor_table);
    return TEST_END();
}
