/* test_order.c - observed orders in time: implicit Euler 1, BDF2 2 (with a restart too), leapfrog
 * 2, all towards one reference.
 *   tier: default
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION test_order.c -lm */
#include "../clothsim.h"

#include "test.h"
#include "dynamics.h"

#define N    7
#define TIME 0.12

/* Scene 0: a stretched square, rim pinned, struck. Scene 1: a sheet that hangs from its top row in
 * equilibrium, pushed out of its plane. Both stay in tension: nothing buckles. */
static void start(dyn *d, int scene, cloth_integrator integrator, double damping) {
    cloth_pin pins[N * N];
    double   *x;
    int       i;
    dyn_sheet(d, CLOTH_SHEET_ALTERNATING, N, N, 1, 1);
    x = dyn_copy(d->mesh->x, 3 * (size_t)d->nv);
    d->desc.pins = pins;
    for (i = 0; i < N * N; i++) {
        const int rim = i % N == 0 || i % N == N - 1 || i / N == N - 1;
        if (i / N == 0 || (scene == 0 && rim)) {
            pins[d->desc.npins].vertex = i;
            pins[d->desc.npins++].axes = CLOTH_AXIS_ALL;
        }
        if (scene == 0) {
            x[3 * i] *= 1.1;
            x[3 * i + 1] *= 1.1;
        }
    }
    d->desc.x = x;
    d->desc.gravity[1] = scene ? -9.81 : 0;
    d->desc.material.poisson = 0;
    d->desc.material.damping = damping;
    d->desc.bend = CLOTH_BEND_HINGE;
    d->desc.material.bending = 1e-4;
    d->desc.tolerance = 1e-11;
    d->desc.cg_tolerance = 1e-8;
    d->desc.integrator = scene ? CLOTH_INTEGRATOR_EULER : integrator;
    dyn_start(d);
    if (scene) {
        CHECK(cloth_solve_static(d->sim, NULL) == CLOTH_OK);
        memcpy(x, d->state->x, 3 * (size_t)d->nv * sizeof *x);
        d->desc.integrator = integrator;
        dyn_restart(d);
    }
    for (i = 0; i < d->nv; i++) {
        const double pi = 3.14159265358979323846, b = (double)(i / N) / (N - 1);
        const double a = sin(pi * (i % N) / (N - 1));
        d->state->v[3 * i + 2] = scene ? 0.5 * b * b : 0.8 * a * sin(pi * b);
    }
    cloth_sim_state_changed(d->sim);
    free(x);
}

/* State at TIME after `steps` steps, [nv x 3] owned by the caller; restart: the history is dropped
 * half way. */
static double *end_state(int scene, cloth_integrator integrator, int steps, int restart,
                         double damping) {
    dyn     d;
    double *x;
    int     n;
    start(&d, scene, integrator, damping);
    for (n = 0; n < steps; n++) {
        cloth_report r;
        CHECK(cloth_step(d.sim, TIME / steps, &r) == CLOTH_OK);
        if (integrator == CLOTH_INTEGRATOR_BDF2)
            CHECK(r.restarts == (n == 0 || (restart && n == steps / 2)));
        if (restart && n == steps / 2 - 1) cloth_sim_state_changed(d.sim);
    }
    x = dyn_copy(d.state->x, 3 * (size_t)d.nv);
    dyn_end(&d);
    return x;
}

/* Leapfrog at two fine steps, the leading error removed. */
static double *reference(int scene) {
    double *a = end_state(scene, CLOTH_INTEGRATOR_LEAPFROG, 2000, 0, 0);
    double *b = end_state(scene, CLOTH_INTEGRATOR_LEAPFROG, 4000, 0, 0);
    int     i;
    for (i = 0; i < 3 * N * N; i++) b[i] += (b[i] - a[i]) / 3;
    free(a);
    return b;
}

static double error(const double *a, const double *b) {
    double sum = 0;
    int    i;
    for (i = 0; i < 3 * N * N; i++) sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum / (N * N));
}

/* Errors at steps, 2 steps, .., 2^(count-1) steps; the order between the last two. */
static double observed(int scene, cloth_integrator integrator, int restart, int steps, int count,
                       const char *name) {
    double *exact = reference(scene), e[8], order;
    int     k;
    for (k = 0; k < count; k++) {
        double *x = end_state(scene, integrator, steps << k, restart, 0);
        e[k] = error(x, exact);
        free(x);
    }
    order = log(e[count - 2] / e[count - 1]) / log(2);
    printf("  %-24s %s:", name, scene ? "hanging  " : "stretched");
    for (k = 0; k < count; k++) printf(" %.2e", e[k]);
    printf("  order %.3f\n", order);
    free(exact);
    return order;
}

static void euler(void) {
    int scene;
    for (scene = 0; scene < 2; scene++)
        CHECK_NEAR(observed(scene, CLOTH_INTEGRATOR_EULER, 0, 100, 4, "implicit Euler"), 1, 0.1);
}

static void bdf2(void) {
    int scene;
    for (scene = 0; scene < 2; scene++)
        CHECK_NEAR(observed(scene, CLOTH_INTEGRATOR_BDF2, 0, 60, 4, "BDF2"), 2, 0.15);
}

static void bdf2_restarted(void) {
    int scene;
    for (scene = 0; scene < 2; scene++)
        CHECK_NEAR(observed(scene, CLOTH_INTEGRATOR_BDF2, 1, 60, 4, "BDF2 restarted half way"), 2,
                   0.15);
}

static void leapfrog(void) {
    int scene;
    for (scene = 0; scene < 2; scene++)
        CHECK_NEAR(observed(scene, CLOTH_INTEGRATOR_LEAPFROG, 0, 100, 4, "leapfrog"), 2, 0.1);
}

/* Damping takes the change of strain over the step divided by h, order 1 in every integrator: BDF2
 * keeps most of its lead all the same. */
static void damped(void) {
    double *fine = end_state(0, CLOTH_INTEGRATOR_EULER, 6400, 0, 0.1);
    double *half = end_state(0, CLOTH_INTEGRATOR_EULER, 3200, 0, 0.1), e[2];
    int     i, k;
    for (i = 0; i < 3 * N * N; i++) fine[i] += fine[i] - half[i];
    free(half);
    for (k = 0; k < 2; k++) {
        double *x = end_state(0, k ? CLOTH_INTEGRATOR_BDF2 : CLOTH_INTEGRATOR_EULER, 200, 0, 0.1);
        e[k] = error(x, fine);
        free(x);
    }
    printf("  damped, 200 steps: implicit Euler %.2e, BDF2 %.2e\n", e[0], e[1]);
    CHECK(e[1] < 0.05 * e[0]);
    free(fine);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(euler);
    RUN(bdf2);
    RUN(bdf2_restarted);
    RUN(leapfrog);
    RUN(damped);
    return TEST_END();
}
