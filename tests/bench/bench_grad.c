/* bench_grad.c - what a derivative costs: a run forwards and its tape backwards, in one program, by
 * CPU time; all causes are asked for. Also what a tape costs the forward run.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_grad.c -lm && ./a.out
 * The hanging sheet, Y = 1e4 N/m, D = 3e-5 N m, h = 1/60 s, forward to 1e-8 m (LEAPFROG: Y = 1e3
 * N/m), adjoint to a residual of 1e-8. Aim: backward at most 0.5 of forward. */
#define _XOPEN_SOURCE 600
#include "../../clothsim_grad.h"
#include "bench.h"

enum { FRAMES = 20 };

typedef struct end_loss {                   /* the distance of the last state from a plane     */
    int n, nv;
} end_loss;

static void at_end(int k, const double *x, const double *v, double *gx, double *gv, void *user) {
    const end_loss *u = (const end_loss *)user;
    int             i;
    (void)v, (void)gv;
    for (i = 0; k == u->n && i < 3 * u->nv; i++) gx[i] += x[i] - 0.5;
}

typedef struct outputs {
    cloth_grad g;
    double    *block;
} outputs;

/* Room for every result of a sheet of nv vertices, nf faces and nh hinges. */
static outputs outputs_make(int nv, int nf, int nh) {
    const size_t n = 3 * (size_t)nv;
    outputs      o;
    double      *d;
    memset(&o, 0, sizeof o);
    o.block = d = (double *)bench_get((4 + 2 * (size_t)FRAMES) * n + 6 * (size_t)nf + 2 * (size_t)nh
                                      + 20, sizeof *d);
    o.g.x0 = d, d += n;
    o.g.v0 = d, d += n;
    o.g.mass = d, d += n;
    o.g.force = d, d += FRAMES * n;
    o.g.pin = d, d += FRAMES * n;
    o.g.X = d, d += 6 * nf;
    o.g.theta0 = d, d += nh;
    o.g.hinge_scale = d, d += nh;
    o.g.gravity = d, d += 3;
    o.g.density = d++, o.g.membrane = d++, o.g.poisson = d++, o.g.bending = d++;
    o.g.damping = d;
    return o;
}

static double forward(int side, cloth_integrator by, double tolerance, double Y, int tape,
                      cloth_grad_report *rep, double *back) {
    cloth_desc         d = bench_desc(Y, 3e-5, tolerance);
    cloth_tape_options o = cloth_tape_options_default();
    cloth_model       *model;
    cloth_sim         *sim;
    cloth_tape        *t = NULL;
    double             t0, cpu;
    int                k;
    d.integrator = by;
    CHECK(!bench_sheet(&d, side, &model, &sim));
    CHECK(!cloth_step(sim, 1.0 / 60, NULL));            /* allocations */
    o.tolerance = 1e-8;
    if (tape) CHECK(!cloth_tape_create(sim, &o, &t));
    t0 = bench_cpu();
    for (k = 0; k < FRAMES; k++) CHECK(!cloth_step(sim, 1.0 / 60, NULL));
    cpu = bench_cpu() - t0;
    if (tape) {
        const cloth_params *p = cloth_sim_params(sim);
        end_loss            u = {FRAMES, p->nv};
        outputs             out = outputs_make(p->nv, p->nf, p->nh);
        t0 = bench_cpu();
        CHECK(!cloth_grad_backward(t, at_end, &u, &out.g, rep));
        *back = bench_cpu() - t0;
        free(out.block);
    }
    cloth_tape_destroy(t);
    bench_free(&model, &sim);
    return cpu;
}

static void ratios(void) {
    static const cloth_integrator by[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                           CLOTH_INTEGRATOR_LEAPFROG};
    static const char *const      name[3] = {"EULER", "BDF2", "LEAPFROG"};
    static const double           tolerance[2] = {1e-8, 1e-4};
    FILE *csv = bench_csv("grad", "integrator,side,tolerance_m,forward_ms,taped_ms,"
                                  "backward_ms,ratio,residual,early");
    int   i, side, j;
    printf("  %-9s %4s %9s %10s %10s %11s %7s %9s %9s %s\n", "", "N", "tol m", "fwd ms", "taped",
           "backward", "ratio", "residual", "early", "valid");
    for (j = 0; j < 2; j++)
        for (i = 0; i < 3; i++)
            for (side = 32; side <= 64; side *= 2) {
                const double      Y = i == 2 ? 1e3 : 1e4;
                cloth_grad_report rep;
                double            back = 0, plain, taped;
                if (i == 2 && j == 1) continue;
                plain = forward(side, by[i], tolerance[j], Y, 0, &rep, &back);
                taped = forward(side, by[i], tolerance[j], Y, 1, &rep, &back);
                printf("  %-9s %4d %9.0e %10.2f %10.2f %11.2f %7.2f %9.1e %9.1e %d\n", name[i],
                       side, tolerance[j], 1e3 * plain / FRAMES, 1e3 * taped / FRAMES,
                       1e3 * back / FRAMES, back / plain, rep.residual, rep.early, rep.valid);
                fprintf(csv, "%s,%d,%.0e,%.4f,%.4f,%.4f,%.4f,%.2e,%.2e\n", name[i], side,
                        tolerance[j], 1e3 * plain / FRAMES, 1e3 * taped / FRAMES,
                        1e3 * back / FRAMES, back / plain, rep.residual, rep.early);
                if (i < 2 && j == 0) OPEN_MOST(back / plain, 0.5, "backward over forward");
            }
    fclose(csv);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(ratios);
    return TEST_END();
}
