/* 04_one_triangle.c - one triangle: deformation gradient, strain, stress, energy, forces; and what
 * the St.Venant-Kirchhoff law does when it is pushed instead of pulled.
 *
 * Notice: cloth_stretch_state() shows what cloth_stretch() computes inside. A rotation changes F
 * but not E: that is why strain is made of F'F. Forces are minus the gradient and sum to zero. The
 * push grows down to a stretch of 1/sqrt(3) = 0.577 and then falls: under a constant load beyond
 * it the triangle collapses. Section [6.2] of clothsim.h derives all of it.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 04_one_triangle.c -lm
 *   page: out/04_one_triangle.svg
 *   expected: the push is largest, 0.192450 Y per metre, at a stretch of 0.577350
 *
 * Exercises: (1) POISSON 0.49: which curve of the kit does not move? (Free sides: plane stress
 * gives Y back.) (2) plane = CLOTH_PLANE_STRAIN_3D: the free sides now answer
 * with Y/(1-nu^2), 10 % more: the last line says 0.211484. (3) Turn by 179 degrees instead of 40: E
 * stays 0 to rounding; now try a mirror image, F = diag(-1, 1): E = 0 too. StVK does not see it.
 */
#include "clothsim.h"
#include "plot.h"

#define YOUNG   100.0               /* N/m: Pa times thickness                              */
#define POISSON 0.3
#define LEG     0.1                 /* m                                                    */

static const double rest[6] = {0, 0, LEG, 0, 0, LEG};
static double       mu, lambda;     /* N/m                                                  */

/* x = F X: corners in space of the triangle under a deformation gradient F [3x2] */
static void deform(const double *F, double *x) {
    int i, r;
    for (i = 0; i < 3; i++)
        for (r = 0; r < 3; r++)
            x[3 * i + r] = F[2 * r] * rest[2 * i] + F[2 * r + 1] * rest[2 * i + 1];
}

/* no "-0.0000" in a table */
static double tidy(double a) { return fabs(a) < 5e-5 ? 0 : a; }

static void show(const char *name, const double *given) {
    double x[9], grad[9], F[6], E[4], S[4], stretch[2], J;
    int    i;
    deform(given, x);
    J = cloth_stretch(x, rest, mu, lambda, grad, NULL, 0);
    (void)cloth_stretch_state(x, rest, mu, lambda, F, E, S, stretch);
    printf("%s: energy %.4g J, principal stretches %.4f and %.4f\n", name, J, stretch[0],
           stretch[1]);
    printf("       F (3x2)              E (2x2)              S (2x2), N/m      force on corner, "
           "N\n");
    for (i = 0; i < 3; i++) {
        printf("  %8.4f %8.4f  ", tidy(F[2 * i]), tidy(F[2 * i + 1]));
        if (i < 2)
            printf("  %8.4f %8.4f    %8.4f %8.4f  ", tidy(E[2 * i]), tidy(E[2 * i + 1]),
                   tidy(S[2 * i]), tidy(S[2 * i + 1]));
        else
            printf("%42s", "");
        printf("  %8.4f %8.4f %8.4f\n", tidy(-grad[3 * i]), tidy(-grad[3 * i + 1]),
               tidy(-grad[3 * i + 2]));
    }
    printf("\n");
}

/* Pull per metre of width along x, N/m, at the stretch l, the sides stretched by l2. The stress is
 * constant, and corner 1 takes half of what goes through the width LEG. */
static double pull(double l, double l2) {
    const double F[6] = {l, 0, 0, l2, 0, 0};
    double       x[9], grad[9];
    deform(F, x);
    (void)cloth_stretch(x, rest, mu, lambda, grad, NULL, 0);
    return grad[3] / (0.5 * LEG);
}

/* the sides' stretch at which they carry nothing: S22 = 0 */
static double narrowing(double l) {
    const double nu2 = lambda / (lambda + 2 * mu), l2 = 1 - nu2 * (l * l - 1);
    return l2 > 0 ? sqrt(l2) : 0;
}

/* Golden section for the largest push between two stretches. */
static double weakest(double lo, double hi) {
    const double g = 0.6180339887498949;
    while (hi - lo > 1e-9) {
        const double a = hi - g * (hi - lo), b = lo + g * (hi - lo);
        if (-pull(a, narrowing(a)) > -pull(b, narrowing(b))) hi = b; else lo = a;
    }
    return 0.5 * (lo + hi);
}

static int chart(void) {
    plot *p = plot_open("Force against stretch of one StVK triangle", "stretch l",
                        "force per metre of width over Y");
    const int free_sides = plot_series(p, "free sides: cloth_stretch");
    const int formula = plot_series(p, "free sides: (l^2 - 1) l / 2");
    const int held = plot_series(p, "sides held: cloth_stretch");
    const int hooke = plot_series(p, "Hooke's spring: l - 1");
    const char *error;
    double worst = 0;
    int    i;
    for (i = 0; i <= 14; i++) {
        const double l = 0.1 * i, exact = 0.5 * l * (l * l - 1);
        const double ours = pull(l, narrowing(l)) / YOUNG;
        plot_point(p, free_sides, l, ours, NULL);
        plot_point(p, held, l, pull(l, 1) / YOUNG, NULL);
        if (fabs(ours - exact) > worst) worst = fabs(ours - exact);
    }
    for (i = 0; i < 28; i++) {
        const double l = 0.05 * i + 0.025;
        plot_point(p, formula, l, 0.5 * l * (l * l - 1), NULL);
    }
    for (i = 0; i <= 7; i++) plot_point(p, hooke, 0.2 * i, 0.2 * i - 1, NULL);
    plot_vline(p, 1 / sqrt(3.0), "1/sqrt(3): it softens below");
    plot_hline(p, 0, NULL);
    printf("chart of the force: largest distance from (l^2 - 1) l / 2: %.1e Y\n", worst);
    error = plot_close(p, "out/04_one_triangle.svg");
    if (error) fprintf(stderr, "out/04_one_triangle.svg: %s\n", error);
    return error != NULL;
}

int main(void) {
    static const double pulled[6] = {1.1, 0, 0, 1, 0, 0}, sheared[6] = {1, 0.2, 0, 1, 0, 0};
    const double        c = cos(40 * acos(-1.0) / 180), s = sin(40 * acos(-1.0) / 180);
    const double        turned[6] = {c, -s * c, s, c * c, 0, s};    /* about z, then about x' */
    cloth_material      m = cloth_material_default();
    double              l;
    m.membrane = YOUNG;
    m.poisson = POISSON;
    m.plane = CLOTH_PLANE_STRESS;
    cloth_material_lame(&m, &mu, &lambda);
    printf("Y = %g N/m, nu = %g: mu = %.3f N/m, lambda = %.3f N/m\n\n", YOUNG, POISSON, mu, lambda);
    show("pulled by 10 % along x", pulled);
    show("sheared by 0.2", sheared);
    show("turned in space", turned);
    printf("  stretch   force/Y, free sides   sides held\n");
    for (l = 1.4; l > 0.05; l -= 0.1)
        printf("  %7.1f   %12.4f   %16.4f\n", l, tidy(pull(l, narrowing(l)) / YOUNG),
               tidy(pull(l, 1) / YOUNG));
    if (chart()) return 1;
    l = weakest(0.3, 0.9);
    printf("the push is largest, %.6f Y per metre, at a stretch of %.6f\n",
           -pull(l, narrowing(l)) / YOUNG, l);
    return 0;
}
