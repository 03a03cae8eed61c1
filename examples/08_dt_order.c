/* 08_dt_order.c - error against time step for the three integrators, and what an error costs.
 *
 * A curtain hangs from its upper edge and is pushed out of its plane, gently enough not to buckle:
 * all that follows is smooth, and the orders show. On log axes the error's slope is the order:
 * implicit Euler 1, BDF2 2, leapfrog 2. The reference is leapfrog with steps of END/20480.
 *
 * Notice: desc.integrator, desc.substeps; desc.tolerance lies far below every error here, so that
 * the solver's own does not show. Clocks are noisy: the second chart, out/08_dt_cost.svg, shows
 * CPU time, the last line only the slopes.                                 sections [9.3] [9.4]
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 08_dt_order.c -lm
 *   page: out/08_dt_order.svg
 *   expected: orders to one digit: Euler 1, BDF2 2, leapfrog 2
 *
 * Exercises: (1) desc.max_newton = 1: half the cost at short steps, but BDF2's errors grow up to
 * seven times. Is desc.tolerance = 1e-4, the default, the better bargain? (Yes.) (2) PUSH
 * 10: at the shortest steps 155 times Euler's error and over 700 times the others', and only there
 * are the slopes right. (3) YOUNG 2000: leapfrog refuses its three longest steps, beyond 2/omega.
 * The others take them all, but BDF2's last slope is 0.6: stretching modes with h omega above 1
 * have lost their phase, and swing by some 1e-6 m. No tolerance mends that; steps of END/10240 do:
 * slope 1.9.
 */
#include "clothsim.h"
#include "plot.h"
#include <string.h>
#include <time.h>

#define NX    9
#define NY    9
#define YOUNG 50.0                  /* N/m                                                  */
#define PUSH  0.5                   /* m/s                                                  */
#define END   0.5                   /* s                                                    */

static cloth_mesh *mesh;
static double     *flat, *curtain, *push;   /* [nv x 3] m, at rest m, m/s                    */

/* The curtain's x at END after n steps into x; n = 0: where it hangs at rest. Returns CPU seconds,
 * negative when a call failed. */
static double run(cloth_integrator integrator, int n, double *x) {
    cloth_desc   desc = cloth_desc_default();
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_pin    pins[NX];
    clock_t      begin;
    double       seconds = -1;
    int          i;
    for (i = 0; i < NX; i++) pins[i].vertex = i, pins[i].axes = CLOTH_AXIS_ALL;
    desc.nv = mesh->nv, desc.x_rest = flat, desc.nf = mesh->nf, desc.faces = mesh->faces;
    desc.x = curtain, desc.v = push, desc.npins = NX, desc.pins = pins;
    desc.material.membrane = YOUNG, desc.material.bending = 1e-4;
    desc.integrator = integrator;
    desc.substeps = 1;
    desc.tolerance = 1e-10;
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) goto done;
    begin = clock();
    if (n == 0 && cloth_solve_static(sim, NULL)) goto done;
    for (i = 0; i < n; i++)
        if (cloth_step(sim, END / n, NULL)) goto done;
    seconds = (double)(clock() - begin) / CLOCKS_PER_SEC;
    memcpy(x, cloth_sim_state(sim)->x, 3 * (size_t)mesh->nv * sizeof *x);
done:
    cloth_sim_destroy(sim), cloth_model_destroy(model);
    return seconds;
}

/* Root mean square distance of the vertices, m. */
static double distance(const double *a, const double *b) {
    double sum = 0;
    int    i;
    for (i = 0; i < 3 * mesh->nv; i++) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum / mesh->nv);
}

/* Errors at n, 2n, 4n, ... steps; returns the slope between the last two. */
static double order(plot *steps, plot *cost, const char *name, cloth_integrator integrator, int n,
                    int last, const double *exact, double *x) {
    const int a = plot_series(steps, name), b = plot_series(cost, name);
    double    error = 0, before = 0;
    char      label[32];
    printf("%s\n      h, ms    error, m    CPU, s\n", name);
    for (; n <= last; n *= 2) {
        const double seconds = run(integrator, n, x);
        before = error, error = seconds < 0 ? (double)NAN : distance(x, exact);
        if (seconds < 0) printf("   %8.4f    the step was refused\n", 1e3 * END / n);
        else printf("   %8.4f    %.2e    %.3f\n", 1e3 * END / n, error, seconds);
        snprintf(label, sizeof label, "%.2g ms", 1e3 * END / n);
        plot_point(steps, a, 1e3 * END / n, error, NULL);
        if (seconds > 0) plot_point(cost, b, seconds, error, label);
    }
    plot_fit(steps, a);
    return log(before / error) / log(2.0);
}

int main(void) {
    plot  *steps = plot_open("Error against step: a swinging curtain", "step h (ms)",
                             "error after 0.5 s (m)");
    plot  *cost = plot_open("Error against cost: a swinging curtain", "CPU time for 0.5 s (s)",
                            "error after 0.5 s (m)");
    double slope[3] = {0, 0, 0}, *exact, *x;
    const char *error;
    int    i, n;
    plot_axes(steps, 1, 1), plot_axes(cost, 1, 1);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, NX, NY, 0.8, 0.8, &mesh)) return 1;
    n = 3 * mesh->nv;
    flat = (double *)calloc(5 * (size_t)n, sizeof *flat);
    if (!flat) return 1;
    curtain = flat + n, push = curtain + n, exact = push + n, x = exact + n;
    for (i = 0; i < mesh->nv; i++) {
        const double down = mesh->x[3 * i + 2];
        flat[3 * i] = curtain[3 * i] = mesh->x[3 * i];
        flat[3 * i + 1] = curtain[3 * i + 1] = -down;
        push[3 * i + 2] = PUSH * down * down;
    }
    if (run(CLOTH_INTEGRATOR_EULER, 0, curtain) < 0) return 1;
    if (run(CLOTH_INTEGRATOR_LEAPFROG, 20480, exact) < 0) return 1;
    slope[0] = order(steps, cost, "implicit Euler", CLOTH_INTEGRATOR_EULER, 20, 640, exact, x);
    slope[1] = order(steps, cost, "BDF2", CLOTH_INTEGRATOR_BDF2, 20, 640, exact, x);
    slope[2] = order(steps, cost, "leapfrog", CLOTH_INTEGRATOR_LEAPFROG, 160, 2560, exact, x);
    error = plot_close(cost, "out/08_dt_cost.svg");
    if (!error) error = plot_close(steps, "out/08_dt_order.svg");
    if (error) return fprintf(stderr, "out/08_dt_*.svg: %s\n", error), 1;
    printf("slopes %.3f %.3f %.3f\n", slope[0], slope[1], slope[2]);
    printf("orders to one digit: Euler %.0f, BDF2 %.0f, leapfrog %.0f\n", slope[0], slope[1],
           slope[2]);
    free(flat), cloth_mesh_destroy(NULL, mesh);
    return 0;
}
