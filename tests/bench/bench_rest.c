/* bench_rest.c - what a frame costs when nothing moves: the hanging sheet at rest against the
 * same sheet falling, by counters and by CPU time, for each implicit integrator.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_rest.c -lm && ./a.out
 * N = 32, Y = 1e4 N/m, D = 3e-5 N m, h = 1/60 s, tolerance 1e-4 m. To rest: implicit Euler with
 * steps of 0.5 s and damping, to 1e-9 m, until no vertex is faster than 1e-7 m/s. */
#define _XOPEN_SOURCE 600
#include "bench.h"

enum { SIDE = 32, NV = SIDE * SIDE, FRAMES = 30, SETTLE = 400 };

typedef struct cost {                       /* a frame                                         */
    double cpu, newton, solves, cg, elements, hessians, moved;
} cost;

/* Positions at rest into x; returns the largest speed left, m/s. */
static double settle(double *x) {
    cloth_desc   d = bench_desc(1e4, 3e-5, 1e-9);
    cloth_model *model;
    cloth_sim   *sim;
    double       speed = HUGE_VAL;
    int          i, k;
    d.material.damping = 0.1;
    CHECK(!bench_sheet(&d, SIDE, &model, &sim));
    for (i = 0; i < SETTLE && speed > 1e-7; i++) {
        if (cloth_step(sim, 0.5, NULL)) break;
        for (k = 0, speed = 0; k < 3 * NV; k++)
            speed = fmax(speed, fabs(cloth_sim_state(sim)->v[k]));
    }
    memcpy(x, cloth_sim_state(sim)->x, 3 * (size_t)NV * sizeof *x);
    printf("  at rest after %d steps of 0.5 s: largest speed %.1e m/s\n", i, speed);
    bench_free(&model, &sim);
    return speed;
}

/* at == NULL: from the horizontal start. The first frame is left out: allocations, no history. */
static cost frames(cloth_integrator integrator, const double *at) {
    cloth_desc   d = bench_desc(1e4, 3e-5, 1e-4);
    cloth_model *model;
    cloth_sim   *sim;
    cloth_report report;
    cost         c;
    double      *zero = (double *)bench_get(3 * (size_t)NV, sizeof *zero);
    int          i, repeat;
    memset(&c, 0, sizeof c);
    d.integrator = integrator;
    CHECK(!bench_sheet(&d, SIDE, &model, &sim));
    for (repeat = 0; repeat < 3; repeat++) {
        double cpu = 0;
        CHECK(!cloth_sim_reset(sim));
        if (at) bench_put(sim, NV, at, zero);
        memset(&c.newton, 0, sizeof c - sizeof c.cpu);
        for (i = 0; i <= FRAMES; i++) {
            const double t0 = bench_cpu();
            CHECK(!cloth_step(sim, 1.0 / 60, &report));
            if (i == 0) continue;
            cpu += (bench_cpu() - t0) / FRAMES;
            c.newton += (double)report.newton / FRAMES;
            c.solves += (double)report.linear_solves / FRAMES;
            c.cg += (double)report.cg / FRAMES;
            c.elements += (double)(report.counts.triangles + report.counts.hinges) / FRAMES;
            c.hessians += (double)report.counts.hessians / FRAMES;
        }
        if (repeat == 0 || cpu < c.cpu) c.cpu = cpu;
    }
    if (at) c.moved = bench_distance(cloth_sim_state(sim)->x, at, NV, NULL);
    bench_free(&model, &sim);
    free(zero);
    return c;
}

static void row(FILE *csv, const char *integrator, const char *what, const cost *c) {
    printf("  %-6s %-7s %10.3f %8.2f %8.2f %9.1f %10.0f %10.0f\n", integrator, what, 1e3 * c->cpu,
           c->newton, c->solves, c->cg, c->elements, c->hessians);
    fprintf(csv, "%s,%s,%.5f,%.3f,%.3f,%.2f,%.0f,%.0f\n", integrator, what, 1e3 * c->cpu,
            c->newton, c->solves, c->cg, c->elements, c->hessians);
}

static void rest(void) {
    static const cloth_integrator integrator[2] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2};
    static const char *const      name[2] = {"EULER", "BDF2"};
    FILE   *csv = bench_csv("rest", "integrator,what,cpu_ms,newton,solves,cg,elements,hessians");
    double *x = (double *)bench_get(3 * (size_t)NV, sizeof *x);
    int     i;
    CHECK(settle(x) <= 1e-6);
    printf("  %-14s %10s %8s %8s %9s %10s %10s   (a frame)\n", "", "CPU ms", "Newton", "solves",
           "CG", "elements", "Hessians");
    for (i = 0; i < 2; i++) {
        const cost moving = frames(integrator[i], NULL), still = frames(integrator[i], x);
        row(csv, name[i], "moving", &moving);
        row(csv, name[i], "resting", &still);
        printf("  ratio resting / moving, %s: CPU %.3f, elements %.3f, CG %.3f (aim below 0.1); "
               "drift %.1e m in %d frames\n", name[i], still.cpu / moving.cpu,
               still.elements / moving.elements, still.cg / fmax(moving.cg, 1), still.moved,
               FRAMES + 1);
        CHECK(still.moved <= 1e-4);
    }
    free(x);
    fclose(csv);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(rest);
    return TEST_END();
}
