/* bench_linear.c - the linear solver on sheets of N x N: microseconds per set-up and per iteration.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -pthread bench/bench_linear.c -lm && ./a.out
 * Matrices as a hanging sheet has them: Y = 1e4 N/m, 60 Hz, taut along one axis and slack across.
 * Minimum of repeated runs; 'plain' is block Jacobi, the textbook CG in doubles.
 *
 * What [7.1] and [7.3] chose between, on a hanging sheet of 64 x 64 when each was built; the parts
 * are numbered as in [7.3].
 *   order  natural, reverse Cuthill-McKee, 8 and 16 leaves differ by less than 10 % once long waves
 *          are deflated; random numbering costs 25 %. Rows by level, so that none waits for the
 *          one just before it: 60 us an iteration for 69 once, nothing since.
 *   2      123 us a matrix.
 *   3      34 iterations where block Jacobi needs 130. Lost: SSOR with omega 1.2 to 1.4 (10 to 20 %
 *          fewer iterations alone, nothing on top of 5), block IC(0) (not fewer, and 4 does not
 *          apply).
 *   4      56 to 65 us an iteration; 245 us in the plain form with doubles.
 *   5      a solve to 0.1 takes 8 iterations (worst 19) with it and 35 (worst 150) without, 100 to
 *          460 whenever a long wave is left; steps are ten times as exact. Lost: adding the coarse
 *          correction instead (12 to 18 iterations), weights smoothed over the graph (fewer
 *          iterations, dearer matrices), affine modes (6.6, but 576 unknowns), 24 or 256 aggregates
 *          (10 % more; the factor too dear). At 60 000 vertices 357 iterations a frame where 128
 *          aggregates need 533. Smoothed aggregation over several levels: 17, 23, 27 iterations at
 *          N = 64, 128, 180 for 80, 77, 116, each 7 times as dear: even at N = 180 and 1e-6, a loss
 *          below.
 *   floats stiffness over inertia [7.3] is 1.1e5 at Y = 1e4 N/m, 60 Hz, 1.1e6 at 1e5. At 1.1e7 (1e6
 *          N/m) Newton stalled with floats in 12 of 15 frames. There a factor instead of doubles
 *          takes 1.5 times the time of bench_hard's T-shirt. Rigid-body modes lose as affine ones.
 *   factor kept over Newton iterations as preconditioner it loses in motion: the matrix changes too
 *          much.
 *   workers  8 to 10 % of a step's time is outside of the loops: two are at most 1.83 times as fast
 *          as one, with what the leaves differ in size and 2 us a loop 1.7 times. */
#define _POSIX_C_SOURCE 200112L
#define CLOTHSIM_IMPLEMENTATION
#include "../../clothsim.h"

#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e6 + (double)t.tv_nsec * 1e-3;
}

/* --- two workers: the second waits in a loop for the next range --- */

typedef struct pool {
    pthread_t        thread;
    volatile int     ticket, done, stop;
    volatile int     next, count;
    cloth_range_fn  *fn;
    void            *ctx;
} pool;

static void take(pool *p, int worker) {
    for (;;) {
        const int i = __sync_fetch_and_add(&p->next, 1);
        if (i >= p->count) return;
        p->fn(i, i + 1, worker, p->ctx);
    }
}

static void *serve(void *user) {
    pool *p = (pool *)user;
    int   seen = 0, spins = 0;
    while (!p->stop) {
        if (p->ticket == seen) {
            if (++spins % 256 == 0) sched_yield();
            continue;
        }
        __sync_synchronize();
        seen = p->ticket;
        take(p, 1);
        __sync_synchronize();
        p->done = seen;
    }
    return NULL;
}

static void run(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    pool *p = (pool *)user;
    (void)grain;
    p->fn = fn;
    p->ctx = ctx;
    p->count = count;
    p->next = 0;
    __sync_synchronize();
    p->ticket++;
    take(p, 0);
    while (p->done != p->ticket) sched_yield();
    __sync_synchronize();
}

/* --- a sheet --- */

static cloth_status build(const cloth_hooks *hooks, int n, cloth_pattern **p, cloth_matrix **A) {
    const int     cells = (n - 1) * (n - 1);
    const double  h2 = 1.0 / 3600, len = 1.0 / (n - 1), mass = 0.2 * len * len / h2, Y = 1e4;
    cloth_mesh   *mesh = NULL;
    cloth_status  status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, 1, 1, &mesh);
    cloth_topology *t = NULL;
    int          *start = NULL, *vertex = NULL, e, k, i, at = 0;
    if (!status) status = cloth_topology_create(NULL, mesh->nv, mesh->nf, mesh->faces, &t);
    if (status) return status;
    start = (int *)calloc((size_t)(mesh->nf + t->nh + 1), sizeof(int));
    vertex = (int *)calloc((size_t)(3 * mesh->nf + 4 * t->nh), sizeof(int));
    if (!start || !vertex || cells < 1) return CLOTH_ERR_MEMORY;
    for (e = 0; e < mesh->nf; e++, start[e] = at)
        for (k = 0; k < 3; k++) vertex[at++] = mesh->faces[3 * e + k];
    for (; e < mesh->nf + t->nh; e++, start[e] = at)
        for (k = 0; k < 4; k++) vertex[at++] = t->hinges[4 * (e - mesh->nf) + k];
    status = cloth_pattern_create(hooks, mesh->nv, e, start, vertex, mesh->x, p);
    if (!status) status = cloth_matrix_create(hooks, *p, A);
    for (e = 0; e < mesh->nf && !status; e++) {
        double X[6], x[9], H[81];
        for (k = 0; k < 3; k++) {
            const double *u = mesh->x + 3 * mesh->faces[3 * e + k];
            X[2 * k] = u[0];
            X[2 * k + 1] = u[2];
            x[3 * k] = 0.97 * u[0];
            x[3 * k + 1] = 0.02 * sin(20 * u[0]);
            x[3 * k + 2] = 1.01 * u[2];
        }
        cloth_stretch(x, X, Y / (2 * 1.3), Y * 0.3 / (1 - 0.09), NULL, H, 1);
        status = cloth_matrix_add_element(*A, 3, vertex + 3 * e, H);
    }
    for (i = 0; i < t->nh && !status; i++) {
        double x[12], w[4], H[144];
        for (k = 0; k < 12; k++) x[k] = mesh->x[3 * t->hinges[4 * i + k / 3] + k % 3];
        memset(H, 0, sizeof H);
        cloth_bend_quadratic_weights(x, w);
        for (k = 0; k < 48; k++)
            H[12 * (k / 4) + 3 * (k % 4) + k / 4 % 3] = 1e-5 * w[k / 12] * w[k % 4];
        status = cloth_matrix_add_element(*A, 4, t->hinges + 4 * i, H);
    }
    for (i = 0; i < mesh->nv && !status; i++) {
        const double H[9] = {mass, 0, 0, 0, mass, 0, 0, 0, mass};
        status = cloth_matrix_add_element(*A, 1, &i, H);
    }
    free(start);
    free(vertex);
    cloth_topology_destroy(NULL, t);
    cloth_mesh_destroy(NULL, mesh);
    return status;
}

/* Minimum time of a solve that stops after `most` iterations. */
static double solve(cloth_linear_solver *s, cloth_matrix *A, const double *b, double *x,
                    cloth_linear_options o, int most, int repeats, int *iterations) {
    cloth_linear_report r;
    double              best = HUGE_VAL;
    int                 k;
    o.max_iterations = most;
    for (k = 0; k < repeats; k++) {
        const double t = now();
        if (cloth_linear_solve(s, A, b, x, &o, &r)) exit(1);
        if (now() - t < best) best = now() - t;
    }
    *iterations = r.iterations;
    return best;
}

static void measure(int n, const cloth_hooks *hooks, int workers) {
    cloth_pattern        *p = NULL;
    cloth_matrix         *A = NULL;
    cloth_linear_solver  *s = NULL;
    unsigned char        *fixed = (unsigned char *)calloc((size_t)(n * n), 1);
    double               *b = (double *)calloc(3 * (size_t)(n * n), sizeof(double));
    double               *x = (double *)calloc(3 * (size_t)(n * n), sizeof(double));
    int                   k, i;
    if (!b || !x || !fixed || build(hooks, n, &p, &A) || cloth_linear_solver_create(hooks, p, &s))
        exit(1);
    fixed[n * n - 1] = fixed[n * n - n] = 7;
    for (i = 0; i < n * n; i++) {
        b[3 * i + 1] = -9.81 * 0.2 / (n * n);
        b[3 * i + 2] = 0.1 * sin(0.1 * i) / (n * n) + (i < n ? 0.02 : 0);
    }
    for (k = 0; k < 2; k++) {
        cloth_linear_options o = cloth_linear_options_default();
        int                  few, many, need, plain;
        double               t1, t2, t3;
        s->only = k ? 2 : 1;
        o.fixed = fixed;
        solve(s, A, b, x, o, 0, 1, &need);
        o.tolerance = 1e-6;
        t1 = solve(s, A, b, x, o, 1, 20, &few);
        t2 = solve(s, A, b, x, o, 11, 20, &many);
        o.method = CLOTH_LINEAR_JACOBI;
        o.tolerance = 0.05;
        t3 = solve(s, A, b, x, o, 0, 1, &plain);
        t2 = (t2 - t1) / (many - few);
        printf("  %4d  %d  %s  set-up %7.0f us   iteration %7.1f us   %4d iterations to 0.05"
               "   plain: %4d of %7.1f us\n", n, workers, k ? "double" : "float ", t1 - t2, t2,
               need, plain, t3 / plain);
        fflush(stdout);
    }
    cloth_linear_solver_destroy(s);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(p);
    free(b);
    free(x);
    free(fixed);
}

int main(void) {
    static pool p;
    cloth_hooks hooks;
    int         k;
    memset(&hooks, 0, sizeof hooks);
    for (k = 0; k < 3; k++) measure(32 << k, &hooks, 1);
    if (pthread_create(&p.thread, NULL, serve, &p)) return 1;
    hooks.parallel.run = run;
    hooks.parallel.user = &p;
    hooks.parallel.max_workers = 2;
    for (k = 0; k < 3; k++) measure(32 << k, &hooks, 2);
    p.stop = 1;
    pthread_join(p.thread, NULL);
    printf("bench_linear.c: 1 passed, 0 failed, 0 skipped (%.1f s)\n",
           (double)clock() / CLOCKS_PER_SEC);
    return 0;
}
