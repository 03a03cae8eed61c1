/* stvk_states.c - uniform states of the St.Venant-Kirchhoff membrane, by element and by statics.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. validate/stvk_states.c -lm
 *
 *   W = lambda/2 tr(E)^2 + mu E:E,  E = (F'F - I)/2,  P = F (lambda tr(E) I + 2 mu E)
 * Rows marked 'full' leave the 1/2 out of E: four times the moduli here.
 * Free sides (uniaxial stress): width^2 = 1 - nu2 (l^2 - 1), N = Y2 l (l^2 - 1)/2 with Y2 = Y,
 * nu2 = nu in plane stress; Y/(1 - nu^2), nu/(1 - nu) with the lambda of a solid (plane strain). */
#include "statics.h"

typedef struct state { const char *name; double nu, F[4], W, P[4]; } state;
static const state states[] = {             /* Y = 1                                           */
    {"uniaxial_stress,planeStress,half", 0.3, {1.2, 0, 0, 0.931665175908169}, 0.0242,
     {0.264, 0, 0, 0}},
    {"uniaxial_stress,lame3D,half", 0.3, {1.2, 0, 0, 0.900793301167683}, 0.0265934065934066,
     {0.29010989010989, 0, 0, 0}},
    {"uniaxial_strain,planeStress,half", 0.3, {1.2, 0, 0, 1}, 0.0265934065934066,
     {0.29010989010989, 0, 0, 0.0725274725274725}},
    {"equibiaxial,planeStress,half", 0.45, {0.8, 0, 0, 0.8}, 0.0589090909090909,
     {-0.261818181818182, 0, 0, -0.261818181818182}},
    {"equibiaxial,lame3D,full", 0.3, {1.05, 0, 0, 1.05}, 0.0202043269230769,
     {0.413942307692308, 0, 0, 0.413942307692308}},
    {"simple_shear,planeStress,half", 0.3, {1, 0.2, 0, 1}, 0.00791208791208791,
     {0.021978021978022, 0.0813186813186813, 0.0769230769230769, 0.021978021978022}},
    {"pure_shear_stretch,lame3D,half", 0.3, {1.2, 0, 0, 0.833333333333333}, 0.0288962191358025,
     {0.249615384615385, 0, 0, -0.0656160968660969}},
    {"simple_shear,lame3D,full", 0.45, {1, 0.05, 0, 1}, 0.00173599137931034,
     {0.0189655172413793, 0.0699137931034483, 0.0689655172413793, 0.0189655172413793}},
};

/* Y = 1. */
static void lame(double nu, int solid, int full, double *mu, double *lambda) {
    const double scale = full ? 4 : 1;
    *mu = scale / (2 * (1 + nu));
    *lambda = scale * nu / (solid ? (1 + nu) * (1 - 2 * nu) : 1 - nu * nu);
}

/* A random rest triangle, deformed by F and turned by R: R' times the stress, from the forces:
 * sum_i grad_i X_i' = area P. Worst difference of W and P over (lambda + 2 mu) |F|^3: F is given
 * to 15 digits. */
static double element_error(unsigned long long *seed, const char *name, double nu,
                            const double *F, double W, const double *P) {
    static const double shift[3] = {0.3, -0.2, 0.5};
    double X[6], x[9], R[9], grad[9], mu, lambda, area, e, worst, size = 0;
    int    i, k, j, r;
    lame(nu, strstr(name, "lame3D") != NULL, strstr(name, "full") != NULL, &mu, &lambda);
    do {
        for (i = 0; i < 6; i++) X[i] = ref_uniform(seed, -1, 1);
        area = 0.5 * ((X[2] - X[0]) * (X[5] - X[1]) - (X[4] - X[0]) * (X[3] - X[1]));
    } while (area < 0.1);
    ref_rotation(seed, R);
    for (i = 0; i < 3; i++) {
        for (k = 0; k < 2; k++) x[3 * i + k] = F[2 * k] * X[2 * i] + F[2 * k + 1] * X[2 * i + 1];
        x[3 * i + 2] = 0;
    }
    ref_move(R, shift, 3, x);
    e = cloth_stretch(x, X, mu, lambda, grad, NULL, 0);
    for (i = 0; i < 4; i++) size = fmax(size, fabs(F[i]));
    worst = fabs(e / area - W);
    for (k = 0; k < 3; k++)
        for (j = 0; j < 2; j++) {
            double p = 0;
            for (i = 0; i < 3; i++)
                for (r = 0; r < 3; r++) p += R[3 * r + k] * grad[3 * i + r] * X[2 * i + j] / area;
            worst = fmax(worst, fabs(p - (k < 2 ? P[2 * k + j] : 0)));
        }
    return worst / ((lambda + 2 * mu) * size * size * size);
}

static void elements(void) {
    unsigned long long seed = 11;
    table  t = table_read("refdata/stvk_states.csv");
    double worst = 0;
    int    k, count = (int)(sizeof states / sizeof *states);
    printf("  state                              nu    stretch    worst of W and P\n");
    for (k = 0; k < count; k++) {
        const state *s = states + k;
        double       e = element_error(&seed, s->name, s->nu, s->F, s->W, s->P);
        printf("  %-34s %.2f  %.4f    %.1e\n", s->name, s->nu, s->F[0], e);
        CHECK(e <= 1e-13);
    }
    for (k = 0; k < t.rows; k++) {
        const double *r = t.at + k * t.columns;
        double        e = element_error(&seed, t.line[k], r[4], r + 6, r[10], r + 11);
        CHECK(e <= 1e-13);
        worst = fmax(worst, e);
    }
    if (t.rows) printf("  all %d states of the table: %.1e\n", t.rows, worst);
    table_free(&t);
}

/* A unit sheet between two jaws that only hold x: width and force against the closed form. */
static void pull(double nu, int solid, double l) {
    const double Y2 = solid ? 1 / (1 - nu * nu) : 1, nu2 = solid ? nu / (1 - nu) : nu;
    const double width = sqrt(1 - nu2 * (l * l - 1)), force = Y2 * l * (l * l - 1) / 2;
    const int    n = 7;
    double       low = 1e300, high = -1e300, N = 0, energy, *grad;
    int          i;
    scene        s;
    scene_sheet(&s, CLOTH_SHEET_ALTERNATING, n, n, 1, 1);
    scene_material(&s, 1, 1, nu, 0);
    s.desc.bend = CLOTH_BEND_NONE;
    s.desc.material.plane = solid ? CLOTH_PLANE_STRAIN_3D : CLOTH_PLANE_STRESS;
    s.desc.tolerance = 1e-12;
    for (i = 0; i < n * n; i++)
        if (i % n == 0 || i % n == n - 1)
            scene_pin(&s, i, CLOTH_AXIS_X | CLOTH_AXIS_Y | (i == 0 ? CLOTH_AXIS_Z : 0u));
    grad = (double *)malloc(3 * (size_t)s.mesh->nv * sizeof *grad);
    if (scene_start(&s)) {
        for (i = n - 1; i < n * n; i += n) {
            const double target[3] = {l, 0, 0};
            CHECK(cloth_sim_pin(s.sim, i, CLOTH_AXIS_X, target) == CLOTH_OK);
        }
        if (scene_solve(&s)) {
            const double *x = scene_x(&s);
            CHECK(cloth_sim_potential(s.sim, x, &energy, grad) == CLOTH_OK);
            for (i = 0; i < n * n; i++) {
                low = fmin(low, x[3 * i + 2]);
                high = fmax(high, x[3 * i + 2]);
                if (i % n == n - 1) N += grad[3 * i];
            }
            printf("  %.2f  %-12s %.3f  %.10f %9.1e  %.10f %9.1e  %8.1e\n", nu,
                   solid ? "plane strain" : "plane stress", l, high - low, high - low - width, N,
                   N - force, energy - Y2 * (l * l - 1) * (l * l - 1) / 8);
            CHECK_NEAR(high - low, width, 1e-10);
            CHECK_NEAR(N, force, 1e-10);
            CHECK_NEAR(energy, Y2 * (l * l - 1) * (l * l - 1) / 8, 1e-12);
        }
    }
    scene_end(&s);
    free(grad);
}

static void free_sides(void) {
    static const double nus[3] = {0, 0.3, 0.45}, stretches[3] = {1.001, 1.1, 1.3};
    int i, k, solid;
    printf("  nu    moduli        l     width        error      force        error      energy\n");
    for (solid = 0; solid < 2; solid++)
        for (i = 0; i < 3; i++)
            for (k = 0; k < 3; k++) pull(nus[i], solid, stretches[k]);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(elements);
    RUN(free_sides);
    return TEST_END();
}
