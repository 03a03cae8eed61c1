/* beam_frequencies.c - a strip whose rows move as one is a beam: its frequencies against
 * refdata/beam_frequencies.csv, omega = (beta L)^2 sqrt(D/(rho L^4)), with order 2 in the edge, and
 * its motion in the first mode against implicit Euler's formula.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/beam_frequencies.c -lm
 *
 *   A clamp is two fixed rows; the hinge over the inner one stands for half an edge of beam, so
 *   that its stiffness is doubled (hinge_scale 2), else the error is of order 1. Hinges over the
 *   rows have c = D b/e; the diagonals stay flat. Rows carry rho b e, free ends half. */
#include "../../clothsim.h"

#include "../test.h"
#include "../dynamics.h"

enum { FREE, PINNED, CLAMPED };

#define MODES 3
#define D_B   1e-3
#define RHO   0.2
#define WIDTH 0.05

static const struct { const char *name; int a, b; double beta[MODES]; } beam[] = {
    {"clamped_free", CLAMPED, FREE, {1.87510406871196, 4.69409113297417, 7.85475743823761}},
    {"clamped_clamped", CLAMPED, CLAMPED, {4.73004074486270, 7.85320462409584, 10.9956078380017}},
    {"free_free", FREE, FREE, {4.73004074486270, 7.85320462409584, 10.9956078380017}},
    {"clamped_pinned", CLAMPED, PINNED, {3.92660231204792, 7.06858274562873, 10.2101761228130}},
    {"pinned_pinned", PINNED, PINNED, {3.14159265358979, 6.28318530717959, 9.42477796076938}},
};
enum { BEAMS = sizeof beam / sizeof *beam };

/* A strip of length 1 between its supports, n edges long; ties join the two vertices of a row,
 * supports are pinned. first, last: rows that move. */
static void strip(dyn *d, int which, int n, int *first, int *last) {
    const int    extra = (beam[which].a == CLAMPED) + (beam[which].b == CLAMPED);
    const int    nx = n + 1 + extra;
    const double e = 1.0 / n;
    cloth_pin   *pins = (cloth_pin *)calloc((size_t)(2 * nx), sizeof *pins);
    cloth_tie   *ties = (cloth_tie *)calloc((size_t)nx, sizeof *ties);
    double      *mass = (double *)calloc((size_t)(2 * nx), sizeof *mass);
    int          i, k;
    *first = beam[which].a == FREE ? 0 : beam[which].a == PINNED ? 1 : 2;
    *last = nx - 1 - (beam[which].b == FREE ? 0 : beam[which].b == PINNED ? 1 : 2);
    dyn_sheet(d, CLOTH_SHEET_DIAGONAL, nx, 2, e * (nx - 1), WIDTH);
    for (i = 0; i < 2 * nx; i++) {
        const int row = i % nx, held = row < *first || row > *last;
        pins[i].vertex = i;
        pins[i].axes = held ? CLOTH_AXIS_ALL : CLOTH_AXIS_Y;
        mass[i] = RHO * WIDTH * e * (row == 0 || row == nx - 1 ? 0.25 : 0.5);
        if (i >= nx && !held) {
            ties[d->desc.nties].leader = row;
            ties[d->desc.nties].follower = i;
            ties[d->desc.nties++].axes = CLOTH_AXIS_X | CLOTH_AXIS_Z;
        }
    }
    d->desc.pins = pins;
    d->desc.npins = 2 * nx;
    d->desc.ties = ties;
    d->desc.vertex_mass = mass;
    d->desc.bend = CLOTH_BEND_HINGE;
    d->desc.material.bending = D_B;
    d->desc.material.poisson = 0;
    d->desc.material.density = RHO;
    d->desc.tolerance = 1e-14;
    d->desc.cg_tolerance = 1e-12;
    if (dyn_start(d)) {
        const cloth_topology *t = cloth_model_topology(d->model);
        cloth_params         *p = cloth_sim_params(d->sim);
        for (k = 0; k < t->nh; k++) {
            const int a = t->hinges[4 * k] % nx, b = t->hinges[4 * k + 1] % nx;
            if (a == b && ((beam[which].a == CLAMPED && a == 1) ||
                           (beam[which].b == CLAMPED && a == nx - 2)))
                p->hinge_scale[k] = 2;
        }
        CHECK(cloth_sim_params_changed(d->sim) == CLOTH_OK);
    }
    free(pins);
    free(ties);
    free(mass);
}

/* omegas of the strip, and its first mode u [rows that move] or NULL. */
static void modes(dyn *d, int which, int first, int last, double *omega, double *u) {
    const int    nx = d->nv / 2, n = last - first + 1, skip = which == 2 ? 2 : 0;
    const double a = 1e-5, shift = which == 2 ? 100 : 0;  /* a free beam's K is singular */
    double      *x = dyn_copy(d->mesh->x, 3 * (size_t)d->nv), *g = dyn_copy(x, 3 * (size_t)d->nv);
    double      *K = (double *)calloc((size_t)(n * n), sizeof *K);
    double      *M = (double *)calloc((size_t)n, sizeof *M), all[MODES + 2];
    double      *shape = (double *)calloc((size_t)(n * (MODES + 2)), sizeof *shape);
    int          i, j, twice;
    for (j = 0; j < n; j++) {
        M[j] = d->mass[first + j] + d->mass[nx + first + j];
        for (twice = 1; twice <= 2; twice++) {
            x[3 * (first + j) + 2] = x[3 * (nx + first + j) + 2] = twice * a;
            CHECK(cloth_sim_potential(d->sim, x, NULL, g) == CLOTH_OK);
            for (i = 0; i < n; i++)
                K[i * n + j] += (g[3 * (first + i) + 2] + g[3 * (nx + first + i) + 2])
                                * (twice == 1 ? 8 : -1) / (6 * a);
        }
        x[3 * (first + j) + 2] = x[3 * (nx + first + j) + 2] = 0;
        K[j * n + j] += shift * M[j];
    }
    dyn_modes(K, M, n, MODES + skip, all, shape);
    for (i = 0; i < MODES; i++) omega[i] = sqrt(all[i + skip] * all[i + skip] - shift);
    if (u) memcpy(u, shape, (size_t)n * sizeof *u);
    free(x);
    free(g);
    free(K);
    free(M);
    free(shape);
}

static void frequencies(void) {
    int which, j, k, first, last;
    for (which = 0; which < BEAMS; which++) {
        double omega[3][MODES];
        for (j = 0; j < 3; j++) {
            dyn d;
            strip(&d, which, 16 << j, &first, &last);
            modes(&d, which, first, last, omega[j], NULL);
            dyn_end(&d);
        }
        for (k = 0; k < MODES; k++) {
            const double exact = beam[which].beta[k] * beam[which].beta[k] * sqrt(D_B / RHO);
            const double e0 = omega[0][k] / exact - 1, e1 = omega[1][k] / exact - 1;
            const double e2 = omega[2][k] / exact - 1, order = log(fabs(e1 / e2)) / log(2);
            const double limit = (4 * omega[2][k] - omega[1][k]) / 3;
            printf("  %-16s mode %d: error %+.1e %+.1e %+.1e, order %.2f, limit %+.1e\n",
                   beam[which].name, k + 1, e0, e1, e2, order, limit / exact - 1);
            CHECK_NEAR(order, 2, 0.1);
            CHECK_REL(limit, exact, 1e-4);
        }
    }
}

static void table(void) {
    FILE  *f = dyn_table("refdata/beam_frequencies.csv");
    double row[5];
    char   word[32];
    int    found = 0, k;
    if (!f) SKIP("no refdata/beam_frequencies.csv");
    while (dyn_csv(f, row, 5, word))
        for (k = 0; k < BEAMS; k++) {
            const int mode = (int)row[1];
            if (strcmp(word, beam[k].name) != 0 || mode > MODES) continue;
            found++;
            CHECK_REL(beam[k].beta[mode - 1], row[2], 1e-13);
            CHECK_REL(pow(beam[k].beta[mode - 1], 2), row[3], 1e-13);
        }
    fclose(f);
    CHECK(found == BEAMS * MODES);
}

/* Pinned at both ends the chain of rigid links has a closed form: K is a product of two second
 * differences, omega = 4/e^2 sqrt(D/rho) sin^2(m pi/2n). */
static void pinned_exactly(void) {
    const double pi = 3.14159265358979323846;
    double       omega[MODES];
    dyn          d;
    int          first, last, m;
    strip(&d, 4, 24, &first, &last);
    modes(&d, 4, first, last, omega, NULL);
    for (m = 1; m <= MODES; m++)
        CHECK_REL(omega[m - 1], 4.0 * 24 * 24 * sqrt(D_B / RHO) * pow(sin(m * pi / 48), 2), 1e-8);
    dyn_end(&d);
}

/* Released from its first mode the tied strip follows implicit Euler's oscillator. */
static void motion(void) {
    const double a = 1e-6;
    double       omega[MODES], u[64], worst = 0, big = 0;
    dyn          d;
    int          first, last, i, n;
    strip(&d, 0, 20, &first, &last);
    modes(&d, 0, first, last, omega, u);
    for (i = first; i <= last; i++) big = fmax(big, fabs(u[i - first]));
    for (i = first; i <= last; i++)
        d.state->x[3 * i + 2] = d.state->x[3 * (i + d.nv / 2) + 2] = a * u[i - first] / big;
    cloth_sim_state_changed(d.sim);
    for (n = 1; n <= 40; n++) {
        const double z = pow(1.09, -0.5 * n) * cos(n * atan(0.3));
        CHECK(cloth_step(d.sim, 0.3 / omega[0], NULL) == CLOTH_OK);
        for (i = first; i <= last; i++) {
            worst = fmax(worst, fabs(d.state->x[3 * i + 2] / a - z * u[i - first] / big));
            CHECK_NEAR(d.state->x[3 * i + 2], d.state->x[3 * (i + d.nv / 2) + 2], 1e-18);
        }
    }
    printf("  first mode, 40 steps: worst %.1e of the amplitude\n", worst);
    CHECK(worst <= 1e-6);
    dyn_end(&d);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(frequencies);
    RUN(pinned_exactly);
    RUN(motion);
    RUN(table);
    return TEST_END();
}
