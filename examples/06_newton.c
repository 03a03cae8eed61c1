/* 06_newton.c - what line search and projection are for: Newton's method on compressed cloth, raw,
 * searched, projected, and mixed as the kit does it, from public elements and a small dense solver.
 *
 *   step        H dx = -g,   x <- x + a dx
 *   raw         a = 1, H exact. Far from a minimum H may be nearly singular (a huge step) or
 *               indefinite: dx then leads to a saddle or a maximum, fast and without complaint
 *   searched    a = 1, 1/2, 1/4, ... until the energy falls. No help where dx leads uphill
 *   projected   H made semidefinite: dx always leads downhill. Slow at the end
 *   mixed       projected while the steps are large, exact once they are small: section [9.2]
 *
 * Notice: the last argument of cloth_stretch and cloth_bend. In H = L D L' the signs of D are those
 * of H's eigenvalues: a minimum has no negative one. There may be several: cloth chooses its waves.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 06_newton.c -lm
 *   expected: raw: saddle, searched: saddle, projected: minimum, mixed: minimum, kit: minimum
 *
 * Exercises: (1) NOISE 0: nothing pushes a sheet that is exactly flat out of its plane, and all end
 * on a saddle but the kit, which pushes by noise where it has ended and follows what falls. (2)
 * SMALL 0: mixed needs as many iterations as projected, three times its own. (3) NOISE 1e-3: raw
 * now stumbles into a minimum, after 44 steps, some of them uphill.
 */
#include "clothsim.h"
#include <math.h>
#include <stdio.h>
#include <string.h>

enum { NX = 25, NY = 3, N = 3 * NX * NY, RAW = 0, SEARCHED, PROJECTED, MIXED, KIT };
#define EDGE    (1.0 / 60)          /* m                                                    */
#define STEP    (1.0 / 60)          /* s                                                    */
#define SQUEEZE 0.9                 /* starting length over rest length                     */
#define NOISE   1e-4                /* m, out of the plane                                  */
#define SMALL   (0.1 * EDGE)        /* m: from here on the exact Hessian                    */

static cloth_mesh    *mesh;
static cloth_sim     *sim;
static cloth_material cloth;
static double         start[N], H[N][N];
static int            held[N];

/* Raw Newton on a bar along x, held at 0, its end at l: energy (l^2-1)^2/16 for Y = 1 N/m. */
static void bar(double l) {
    static const double X[6] = {0, 0, 1, 0, 0, 1};
    double x[9] = {0, 0, 0, 0, 0, 0, 0, 1, 0}, g[9], h[81];
    int    it;
    printf("a bar released at the stretch %.2f, raw:", l);
    for (it = 0; it < 7; it++) {
        x[3] = l;
        (void)cloth_stretch(x, X, 0.5, 0, g, h, 0);
        printf(it < 6 ? " %.2f" : " %.2f\n", l -= g[3] / h[9 * 3 + 3]);
    }
}

/* phi(x) = |x - start|_M^2/(2 h^2) + stretch + bend: an implicit Euler step from rest. With grad
 * also H, by looping over elements and adding each one's [n x n] to the rows of its corners. */
static double phi(const double *x, double *grad, int psd) {
    const cloth_topology *top = cloth_model_topology(cloth_sim_model(sim));
    double mu, lambda, sum = 0, p[12], g[12], h[144];
    int    e, i, j, n;
    cloth_material_lame(&cloth, &mu, &lambda);
    if (grad) memset(grad, 0, N * sizeof *grad), memset(H, 0, sizeof H);
    for (e = 0; e < mesh->nf + top->nh; e++) {
        const int  k = e - mesh->nf;
        const int *v = k < 0 ? mesh->faces + 3 * e : top->hinges + 4 * k;
        for (n = k < 0 ? 9 : 12, i = 0; i < n; i++) p[i] = x[3 * v[i / 3] + i % 3];
        if (k < 0) sum += cloth_stretch(p, mesh->X + 6 * e, mu, lambda, g, h, psd);
        else {                              /* diagonals join x and z: twice a leg's square */
            const int diagonal = v[0] / NX != v[1] / NX && v[0] % NX != v[1] % NX;
            sum += cloth_bend(p, cloth.bending * (diagonal ? 2 : 1), 0, g, h, psd);
        }
        for (i = 0; grad && i < n; i++) {
            grad[3 * v[i / 3] + i % 3] += g[i];
            for (j = 0; j < n; j++) H[3 * v[i / 3] + i % 3][3 * v[j / 3] + j % 3] += h[n * i + j];
        }
    }
    for (i = 0; i < N; i++) {
        const double m = cloth_sim_params(sim)->mass[i / 3] / (STEP * STEP), d = x[i] - start[i];
        sum += 0.5 * m * d * d;
        if (grad) grad[i] = held[i] ? 0 : grad[i] + m * d, H[i][i] += m;
        for (j = 0; grad && held[i] && j < N; j++) H[i][j] = H[j][i] = i == j;
    }
    return sum;
}

/* Solves H dx = -g by H = L D L' (L below the diagonal, D on it). Returns the negative pivots. */
static int solve(const double *g, double *dx) {
    int i, j, k, negative = 0;
    for (j = 0; j < N; negative += H[j][j] < 0, j++) {
        for (i = j + 1; i < N; i++)
            for (k = j + 1; k <= i && H[i][j] != 0; k++) H[i][k] -= H[i][j] / H[j][j] * H[k][j];
        for (i = j + 1; i < N; i++) H[i][j] /= H[j][j];
    }
    for (i = 0; i < N; i++)
        for (dx[i] = -g[i], k = 0; k < i; k++) dx[i] -= H[i][k] * dx[k];
    for (i = N - 1; i >= 0; i--)
        for (dx[i] /= H[i][i], k = i + 1; k < N; k++) dx[i] -= H[k][i] * dx[k];
    return negative;
}

static const char *minimise(const char *name, int way) {    /* returns what it ended on */
    static double x[N], trial[N], g[N], dx[N];
    cloth_report  report;
    double value, slope, big = 1, a = 1;
    int    i, it, psd, negative;
    memcpy(x, start, sizeof x);
    for (it = 0; way != KIT && it < 300 && big > 1e-8 && a > 1e-6; it++) {
        psd = way == PROJECTED || (way == MIXED && big > SMALL);
        value = phi(x, g, psd);
        if (solve(g, dx) && way == MIXED) (void)phi(x, g, 1), (void)solve(g, dx);
        for (i = 0, slope = 0, big = 0; i < N; i++)
            slope += g[i] * dx[i], big = fabs(dx[i]) > big ? fabs(dx[i]) : big;
        for (a = 1;; a *= 0.5) {            /* the last test: no digits are left to compare */
            for (i = 0; i < N; i++) trial[i] = x[i] + a * dx[i];
            if (way == RAW || a < 1e-6 || phi(trial, NULL, 0) < value + 1e-4 * a * slope ||
                fabs(a * slope) < 1e-14 * value) break;
        }
        memcpy(x, trial, sizeof x);
    }
    if (way == KIT && cloth_step(sim, STEP, &report)) return "refused";
    if (way == KIT) it = report.newton, big = report.residual_m;
    if (way == KIT) memcpy(x, cloth_sim_state(sim)->x, sizeof x);
    value = phi(x, g, 0), negative = solve(g, dx);
    printf("  %-10s %3d iterations, last step %.0e m, energy %.8f J, %2d negative pivots\n", name,
           it, big, value, negative);
    return negative ? "saddle" : "minimum";
}

int main(void) {
    static const char *name[5] = {"raw", "searched", "projected", "mixed", "kit"}, *end[5];
    cloth_desc   desc = cloth_desc_default();
    cloth_model *model = NULL;
    cloth_pin    pins[2 * NY];              /* both ends */
    int          i, k;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, NX, NY, 24 * EDGE, 2 * EDGE, &mesh))
        return 1;
    for (i = 0; i < N; i++) start[i] = i % 3 == 0 ? SQUEEZE * mesh->x[i] : mesh->x[i];
    for (i = 0; i < NX * NY; i++) start[3 * i + 1] = NOISE * sin(5.0 * i);
    for (i = 0; i < 2 * NY; i++) {
        pins[i].vertex = i / 2 * NX + i % 2 * (NX - 1), pins[i].axes = CLOTH_AXIS_ALL;
        for (k = 0; k < 3; k++) held[3 * pins[i].vertex + k] = 1;
    }
    cloth = cloth_material_default(), cloth.membrane = 1000, cloth.bending = 1e-3;
    desc.nv = mesh->nv, desc.x_rest = mesh->x, desc.nf = mesh->nf, desc.faces = mesh->faces;
    desc.x = start, desc.material = cloth, desc.npins = 2 * NY, desc.pins = pins;
    desc.gravity[1] = 0, desc.tolerance = 1e-8;
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
    bar(0.60), bar(0.57), printf("a strip, squeezed to %.2f of its length, one step\n", SQUEEZE);
    for (i = 0; i < 5; i++) end[i] = minimise(name[i], i);
    for (i = 0; i < 5; i++) printf("%s: %s%s", name[i], end[i], i < 4 ? ", " : "\n");
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, mesh);
    return 0;
}
