/* 05_gradient_check.c - how to check a gradient and a Hessian: compare with central differences,
 * and look at the error against the step of the difference.
 *
 *   (E(x + d u) - E(x - d u)) / (2 d) = g.u + O(d^2)      truncation: falls with d
 *                                          + O(eps E/d)   rounding: grows as d falls
 * Together a V on log axes, its bottom near d = eps^(1/3) of the size of things, at 1e-9 or below.
 * A wrong gradient has no V: its curve goes flat at the size of the mistake. So look at the curve
 * (or at its slope), not at one number.
 *
 * Notice: cloth_stretch, cloth_bend: psd = 0 asks for the exact Hessian. cloth_sim_potential: the
 * same check for a whole scene, your own terms included.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 05_gradient_check.c -lm
 *   page: out/05_gradient_check.svg
 *   expected: triangle ok, hinge ok, their Hessians ok, sheet ok, the planted mistake found
 *
 * Exercises: (1) psd = 1 in hinge_gradient: that Hessian is no derivative of the gradient, and its
 * curve is flat. (2) MISTAKE 1.0001: the flat part sinks a hundredfold, below the program's bound.
 * What else in the chart would still give it away? (3) ORIGIN 1000: the hinge's two V bottom
 * out 200 and 140 times higher. Coordinates have 16 digits, lengths are their differences.
 */
#include "clothsim.h"
#include "plot.h"

#define MISTAKE 1.01                /* factor on one entry of a gradient                    */
#define ORIGIN  0.0                 /* m                                                    */
#define MOST    (3 * 400)

/* A function to check: value at x, its derivative g along with it when wanted. */
typedef double value_fn(const double *x, double *g, void *user);

static double triangle(const double *x, double *g, void *user) {
    static const double X[6] = {0, 0, 1, 0, 0.3, 0.9};
    (void)user;
    return cloth_stretch(x, X, 40, 30, g, NULL, 0);
}

static double hinge(const double *x, double *g, void *user) {
    (void)user;
    return cloth_bend(x, 1.0, 0.2, g, NULL, 0);
}

/* A Hessian is checked as the derivative of g.w, for a fixed w: value g.w, derivative H w. */
static const double w[12] = {.3, -.7, .2, .9, .1, -.4, -.6, .5, .8, -.1, .4, -.9};

static double contract(int n, const double *grad, const double *hess, double *g) {
    double sum = 0;
    int    i, j;
    for (i = 0; i < n; i++) {
        if (g) g[i] = 0;
        for (j = 0; g && j < n; j++) g[i] += hess[n * i + j] * w[j];
        sum += grad[i] * w[i];
    }
    return sum;
}

static double triangle_gradient(const double *x, double *g, void *user) {
    static const double X[6] = {0, 0, 1, 0, 0.3, 0.9};
    double grad[9], hess[81];
    (void)user, (void)cloth_stretch(x, X, 40, 30, grad, hess, 0);
    return contract(9, grad, hess, g);
}

static double hinge_gradient(const double *x, double *g, void *user) {
    double grad[12], hess[144];
    (void)user, (void)cloth_bend(x, 1.0, 0.2, grad, hess, 0);
    return contract(12, grad, hess, g);
}

static double sheet(const double *x, double *g, void *user) {
    double energy = (double)NAN;    /* a failed call must fail the check                    */
    if (cloth_sim_potential((cloth_sim *)user, x, &energy, g)) return (double)NAN;
    return energy;
}

static double mistaken(const double *x, double *g, void *user) {
    const double energy = triangle(x, g, user);
    if (g) g[4] *= MISTAKE;
    return energy;
}

/* Draws the V of one function along a fixed direction u; returns its lowest point. The error is
 * relative to sum |g_i u_i|, which unlike g.u is not small by accident. */
static double vee(plot *p, const char *name, value_fn *f, int n, const double *x, void *user) {
    static double g[MOST], u[MOST], y[MOST];
    const int     line = plot_series(p, name);
    double        exact = 0, scale = 0, best = HUGE_VAL, d;
    int           i;
    (void)f(x, g, user);
    for (i = 0; i < n; i++) {
        u[i] = sin(7.0 * i + 1);
        exact += g[i] * u[i];
        scale += fabs(g[i] * u[i]);
    }
    for (d = 0.1; d > 1e-12; d *= 0.31622776601683794) {
        double ahead, back, error;
        for (i = 0; i < n; i++) y[i] = x[i] + d * u[i];
        ahead = f(y, NULL, user);
        for (i = 0; i < n; i++) y[i] = x[i] - d * u[i];
        back = f(y, NULL, user);
        error = fabs((ahead - back) / (2 * d) - exact) / scale;
        plot_point(p, line, d, error > 1e-16 ? error : 1e-16, NULL);
        if (!(error >= best)) best = error;
    }
    printf("%-44s lowest relative error %.1e\n", name, best);
    return best;
}

/* A sheet in a wave, with pins and gravity: everything that cloth_sim_potential adds up. */
static int sheet_check(plot *p, double *lowest) {
    cloth_mesh  *mesh = NULL;
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_desc   desc = cloth_desc_default();
    int          i, status = 1;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_EQUILATERAL, 12, 0, 1.0, 1.0, &mesh)) goto done;
    desc.nv = mesh->nv, desc.x_rest = mesh->x, desc.nf = mesh->nf, desc.faces = mesh->faces;
    if (3 * mesh->nv > MOST) goto done;
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) goto done;
    for (i = 0; i < mesh->nv; i++) mesh->x[3 * i + 1] = 0.1 * sin(9 * mesh->x[3 * i]);
    *lowest = vee(p, "a whole sheet, gradient", sheet, 3 * mesh->nv, mesh->x, sim);
    status = 0;
done:
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, mesh);
    return status;
}

int main(void) {
    const double t[9] = {0, 0, 0.1, 1.2, 0.1, 0, 0.2, 0.8, -0.2};
    double       h[12] = {0, 0, 0, 1, 0, 0, 0.4, 0.8, 0.3, 0.6, -0.7, 0.4}, low[6];
    plot        *p = plot_open("Central differences against the exact derivative",
                               "step of the difference (m)", "relative error");
    const char  *error;
    int          i;
    for (i = 0; i < 12; i++) h[i] += ORIGIN;
    plot_axes(p, 1, 1);
    low[0] = vee(p, "triangle, gradient", triangle, 9, t, NULL);
    low[1] = vee(p, "hinge, gradient", hinge, 12, h, NULL);
    low[2] = vee(p, "triangle, Hessian", triangle_gradient, 9, t, NULL);
    low[3] = vee(p, "hinge, Hessian", hinge_gradient, 12, h, NULL);
    if (sheet_check(p, &low[4])) return fprintf(stderr, "the sheet was refused\n"), 1;
    low[5] = vee(p, "triangle, one entry 1 % wrong", mistaken, 9, t, NULL);
    error = plot_close(p, "out/05_gradient_check.svg");
    if (error) return fprintf(stderr, "out/05_gradient_check.svg: %s\n", error), 1;
    printf("triangle %s, hinge %s, their Hessians %s, sheet %s, the planted mistake %s\n",
           low[0] < 1e-8 ? "ok" : "WRONG", low[1] < 1e-8 ? "ok" : "WRONG",
           low[2] < 1e-8 && low[3] < 1e-8 ? "ok" : "WRONG", low[4] < 1e-8 ? "ok" : "WRONG",
           low[5] > 1e-5 ? "found" : "NOT FOUND");
    return 0;
}
