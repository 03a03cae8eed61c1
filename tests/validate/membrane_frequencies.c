/* membrane_frequencies.c - a stretched membrane rings as refdata/membrane_frequencies.csv says for
 * its mesh (1e-8) and, a drum, as the zeros of Bessel functions say in the limit (order 2).
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. \
 *      validate/membrane_frequencies.c -lm
 *
 *   rho w'' = S lap_X w,  S = Y h/(1 - nu) (l^2 - 1)/2, X rest coordinates, l the prestretch.
 *   Square of side a0 at rest, right triangles, lumped masses, edge e = a0/N, exactly:
 *   omega^2 = 4 S/(rho e^2) (sin^2(m pi/2N) + sin^2(n pi/2N)), mode sin(m pi X) sin(n pi Y). */
#include "../../clothsim.h"

#include "../test.h"
#include "../dynamics.h"

#define PI 3.14159265358979323846

/* A square sheet of side 1, N cells a side, stretched by l in its plane, its rim pinned. */
static void stretched(dyn *d, int N, double l, double nu, cloth_integrator integrator) {
    const int  n = N + 1;
    cloth_pin *pins = (cloth_pin *)calloc((size_t)(n * n), sizeof *pins);
    double    *x;
    int        i, npins = 0;
    dyn_sheet(d, CLOTH_SHEET_DIAGONAL, n, n, 1, 1);
    x = dyn_copy(d->mesh->x, 3 * (size_t)d->nv);
    for (i = 0; i < 3 * d->nv; i++) x[i] *= l;
    for (i = 0; i < n * n; i++)
        if (i % n == 0 || i % n == N || i / n == 0 || i / n == N) {
            pins[npins].vertex = i;
            pins[npins++].axes = CLOTH_AXIS_ALL;
        }
    d->desc.x = x;
    d->desc.npins = npins;
    d->desc.pins = pins;
    d->desc.material.poisson = nu;
    d->desc.integrator = integrator;
    d->desc.tolerance = 1e-13;
    d->desc.cg_tolerance = 1e-12;
    dyn_start(d);
    free(x);
    free(pins);
}

static double shape(int i, int n, int m, int k) {
    return sin(m * PI * (i % n) / (n - 1)) * sin(k * PI * (i / n) / (n - 1));
}

/* omega of mode (m, k) by the forces of its shape at amplitudes a and 2 a, combined so that their
 * cubes cancel; *residual: how far the force is from omega^2 M u. */
static double frequency(dyn *d, int n, int m, int k, double *residual) {
    const double  a = 1e-3;
    const size_t  bytes = 3 * (size_t)d->nv * sizeof(double);
    double       *x = (double *)malloc(bytes), *g1 = (double *)malloc(bytes);
    double       *g2 = (double *)malloc(bytes);
    double        up = 0, down = 0, worst = 0, big = 0;
    int           i;
    memcpy(x, d->state->x, bytes);
    for (i = 0; i < d->nv; i++) x[3 * i + 2] = a * shape(i, n, m, k);
    CHECK(cloth_sim_potential(d->sim, x, NULL, g1) == CLOTH_OK);
    for (i = 0; i < d->nv; i++) x[3 * i + 2] *= 2;
    CHECK(cloth_sim_potential(d->sim, x, NULL, g2) == CLOTH_OK);
    for (i = 0; i < d->nv; i++) {
        g1[3 * i] = (8 * g1[3 * i + 2] - g2[3 * i + 2]) / (6 * a);
        up += shape(i, n, m, k) * g1[3 * i];
        down += d->mass[i] * shape(i, n, m, k) * shape(i, n, m, k);
    }
    for (i = 0; i < d->nv; i++) {
        const int inside = i % n && i % n < n - 1 && i / n && i / n < n - 1;
        if (!inside) continue;
        worst = fmax(worst, fabs(g1[3 * i] - up / down * d->mass[i] * shape(i, n, m, k)));
        big = fmax(big, fabs(g1[3 * i]));
    }
    *residual = worst / big;
    free(x);
    free(g1);
    free(g2);
    return sqrt(up / down);
}

static void square_formula(void) {
    static const double l[] = {1.01, 1.1, 1.3}, nu[] = {0, 0.3, 0.45};
    const int N = 12;
    int       i, m, k;
    double    worst = 0;
    for (i = 0; i < 3; i++) {
        dyn d;
        stretched(&d, N, l[i], nu[i], CLOTH_INTEGRATOR_EULER);
        for (m = 1; m <= 4; m++)
            for (k = 1; k <= 4; k++) {
                const double S = 100 / (1 - nu[i]) * (l[i] * l[i] - 1) / 2;
                const double q = pow(sin(m * PI / (2 * N)), 2) + pow(sin(k * PI / (2 * N)), 2);
                double       residual, omega = frequency(&d, N + 1, m, k, &residual);
                worst = fmax(worst, fabs(omega / sqrt(4 * S * N * N / 0.2 * q) - 1));
                CHECK(residual <= 1e-7);
            }
        dyn_end(&d);
    }
    printf("  modes (1..4, 1..4), 3 prestretches: worst relative difference %.1e\n", worst);
    CHECK(worst <= 1e-8);
}

static void square_table(void) {
    FILE  *f = dyn_table("refdata/membrane_frequencies.csv");
    double row[9], worst[3] = {0, 0, 0};
    int    rows = 0, j;
    if (!f) SKIP("no refdata/membrane_frequencies.csv");
    printf("  l      nu   mode   ours N=32        reference N=32   continuum\n");
    while (dyn_csv(f, row, 9, NULL)) {
        const int m = (int)row[2], k = (int)row[3];
        double    omega = 0;
        rows++;
        for (j = 0; j < 3; j++) {           /* N = 8, 16, 32 */
            dyn    d;
            double residual;
            stretched(&d, 8 << j, row[0], row[1], CLOTH_INTEGRATOR_EULER);
            omega = frequency(&d, (8 << j) + 1, m, k, &residual) * sqrt(0.2 / 100);
            worst[j] = fmax(worst[j], fabs(omega / row[6 + j] - 1));
            dyn_end(&d);
        }
        if (rows % 5 == 1)
            printf("  %.3f  %.1f  (%d,%d)  %.12f   %.12f   %.9f\n", row[0], row[1], m, k, omega,
                   row[8], row[5]);
    }
    fclose(f);
    printf("  %d rows: worst relative difference %.1e, %.1e, %.1e (N = 8, 16, 32)\n", rows,
           worst[0], worst[1], worst[2]);
    CHECK(rows >= 20);
    for (j = 0; j < 3; j++) CHECK(worst[j] <= 1e-8);
}

/* The motion: released from mode (1, 2), small, the sheet follows its integrator's formula. */
static void square_motion(void) {
    const int    N = 10, steps = 60;
    const double S = 100 / 0.7 * (1.1 * 1.1 - 1) / 2, a = 1e-5;
    const double q = pow(sin(PI / (2 * N)), 2) + pow(sin(PI / N), 2);
    const double omega = sqrt(4 * S * N * N / 0.2 * q), h = 0.3 / omega;
    int          integrator, i, n;
    for (integrator = CLOTH_INTEGRATOR_LEAPFROG; integrator <= CLOTH_INTEGRATOR_EULER;
         integrator++) {
        dyn    d;
        double worst = 0;
        stretched(&d, N, 1.1, 0.3, (cloth_integrator)integrator);
        for (i = 0; i < d.nv; i++) d.state->x[3 * i + 2] = a * shape(i, N + 1, 1, 2);
        cloth_sim_state_changed(d.sim);
        for (n = 1; n <= steps; n++) {
            cloth_report r;
            double       z;
            CHECK(cloth_step(d.sim, h, &r) == CLOTH_OK);
            if (integrator == CLOTH_INTEGRATOR_EULER)
                z = pow(1.09, -0.5 * n) * cos(n * atan(0.3));
            else
                z = cos(2 * n * r.substeps * asin(0.15 / r.substeps));
            for (i = 0; i < d.nv; i++)
                worst = fmax(worst, fabs(d.state->x[3 * i + 2] / a - z * shape(i, N + 1, 1, 2)));
        }
        printf("  %-14s mode (1,2) over %d steps: worst %.1e of the amplitude\n",
               integrator == CLOTH_INTEGRATOR_EULER ? "implicit Euler" : "leapfrog", steps, worst);
        CHECK(worst <= 1e-6);
        dyn_end(&d);
    }
}

/* ---- drum ----------------------------------------------------------------------------------- */

#define MODES 6                             /* j01, j11 twice, j21 twice, j02 */

static void drum_modes(int rings, double *omega) {
    const double l = 1.05, a = 1e-3;
    cloth_mesh  *mesh = NULL;
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_desc   desc = cloth_desc_default();
    double      *x, *g, *K, S;
    int          i, j, n = 1 + 3 * rings * (rings - 1);
    CHECK(cloth_mesh_disc(NULL, 1, rings, &mesh) == CLOTH_OK);
    desc.nv = mesh->nv;
    desc.nf = mesh->nf;
    desc.x_rest = mesh->x;
    desc.faces = mesh->faces;
    desc.bend = CLOTH_BEND_NONE;
    desc.gravity[1] = 0;
    desc.material.membrane = 100;
    desc.material.poisson = 0.3;
    desc.material.density = 0.2;
    CHECK(cloth_model_create(&desc, &model) == CLOTH_OK);
    CHECK(cloth_sim_create(model, &sim) == CLOTH_OK);
    S = 100 / 0.7 * (l * l - 1) / 2;
    x = dyn_copy(mesh->x, 3 * (size_t)mesh->nv);
    g = dyn_copy(mesh->x, 6 * (size_t)mesh->nv / 2);
    K = (double *)calloc((size_t)n * (size_t)n, sizeof *K);
    for (i = 0; i < 3 * mesh->nv; i++) x[i] *= l;
    for (j = 0; j < n; j++) {               /* the disc lies in y = 0; force of y_j = a, 2 a */
        int twice;
        for (twice = 1; twice <= 2; twice++) {
            x[3 * j + 1] = twice * a;
            CHECK(cloth_sim_potential(sim, x, NULL, g) == CLOTH_OK);
            for (i = 0; i < n; i++)
                K[i * n + j] += g[3 * i + 1] * (twice == 1 ? 8 : -1) / (6 * a);
        }
        x[3 * j + 1] = 0;
    }
    dyn_modes(K, cloth_sim_params(sim)->mass, n, MODES, omega, NULL);
    for (i = 0; i < MODES; i++) omega[i] *= sqrt(0.2 / S);
    free(x);
    free(g);
    free(K);
    cloth_sim_destroy(sim);
    cloth_model_destroy(model);
    cloth_mesh_destroy(NULL, mesh);
}

static void drum(void) {
    double    zero[MODES] = {2.404825557695773, 3.831705970207512, 3.831705970207512,
                             5.135622301840683, 5.135622301840683, 5.520078110286311};
    double    omega[3][MODES], row[3];
    FILE     *f = dyn_table("refdata/drum_bessel.csv");
    int       j, k, found = 0;
    while (f && dyn_csv(f, row, 3, NULL))
        for (k = 0; k < MODES; k++) found += fabs(zero[k] - row[2]) < 1e-13;
    if (f) {
        CHECK(found == MODES);
        fclose(f);
    }
    for (j = 0; j < 3; j++) drum_modes(4 << j, omega[j]);
    for (k = 0; k < MODES; k++) {
        const double e0 = omega[0][k] - zero[k], e1 = omega[1][k] - zero[k];
        const double e2 = omega[2][k] - zero[k];
        const double order = log(fabs(e1 / e2)) / log(2);
        printf("  j = %.6f: error %+.1e %+.1e %+.1e, order %.2f\n", zero[k], e0, e1, e2, order);
        CHECK_NEAR(order, 2, 0.15);
        CHECK(fabs(e2) < 0.01 * zero[k]);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(square_formula);
    RUN(square_table);
    RUN(square_motion);
    RUN(drum);
    return TEST_END();
}
