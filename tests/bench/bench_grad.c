/* bench_grad.c - what a derivative costs: a run forwards and its tape backwards, in one program, by
 * CPU time; all causes are asked for. Also what a tape costs the forward run.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_grad.c -lm && ./a.out
 * The hanging sheet, free and on a sphere, Y = 1e4 N/m, D = 3e-5 N m, h = 1/60 s, forward to 1e-8 m
 * (LEAPFROG: Y = 1e3 N/m), adjoint to a residual of 1e-8. Aim: backward at most 0.5 of forward. */
#define _XOPEN_SOURCE 600
#include "../../clothsim_collide.h"
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

/* A sphere under the middle of the sheet, which lies on it when its recording begins. */
static cloth_collide *sphere(cloth_sim *sim) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    const double        at[3] = {0.5, -0.3, 0.5};
    cloth_collide      *c = NULL;
    int                 k;
    d.kind = CLOTH_OBSTACLE_SPHERE;
    d.x = at;
    d.radius = 0.29;
    CHECK(!cloth_collide_create(sim, NULL, &c) && !cloth_collide_add(c, &d, NULL));
    for (k = 0; k < 12; k++) CHECK(!cloth_step(sim, 1.0 / 60, NULL));
    return c;
}

static double forward(int side, cloth_integrator by, double tolerance, double Y, int touch,
                      int tape, cloth_grad_report *rep, double *back) {
    cloth_desc         d = bench_desc(Y, 3e-5, tolerance);
    cloth_tape_options o = cloth_tape_options_default();
    cloth_model       *model;
    cloth_sim         *sim;
    cloth_tape        *t = NULL;
    cloth_collide     *c = NULL;
    double             t0, cpu;
    int                k;
    d.integrator = by;
    if (touch) d.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(!bench_sheet(&d, side, &model, &sim));
    if (touch) c = sphere(sim);
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
    cloth_collide_destroy(c);
    bench_free(&model, &sim);
    return cpu;
}

typedef struct row {
    const char      *name;
    cloth_integrator by;
    double           tolerance, Y;
    int              touch;
} row;

static void ratios(void) {
    static const row rows[] = {
        {"EULER", CLOTH_INTEGRATOR_EULER, 1e-8, 1e4, 0},
        {"BDF2", CLOTH_INTEGRATOR_BDF2, 1e-8, 1e4, 0},
        {"EULER, sphere", CLOTH_INTEGRATOR_EULER, 1e-8, 1e4, 1},
        {"BDF2, sphere", CLOTH_INTEGRATOR_BDF2, 1e-8, 1e4, 1},
        {"EULER", CLOTH_INTEGRATOR_EULER, 1e-4, 1e4, 0},
        {"EULER, sphere", CLOTH_INTEGRATOR_EULER, 1e-4, 1e4, 1},
        {"LEAPFROG", CLOTH_INTEGRATOR_LEAPFROG, 1e-8, 1e3, 0}};
    FILE *csv = bench_csv("grad", "scene,side,tolerance_m,forward_ms,taped_ms,backward_ms,ratio,"
                                  "residual,early,directions,bytes");
    int   i, side;
    printf("  %-14s %3s %6s %8s %8s %9s %6s %9s %8s %6s %7s %s\n", "", "N", "tol m", "fwd ms",
           "taped", "backward", "ratio", "residual", "early", "GMRES", "MB", "valid");
    for (i = 0; i < (int)(sizeof rows / sizeof *rows); i++)
        for (side = 32; side <= 64; side *= 2) {
            const row        *q = rows + i;
            cloth_grad_report rep;
            double            back = 0, plain, taped;
            plain = forward(side, q->by, q->tolerance, q->Y, q->touch, 0, &rep, &back);
            taped = forward(side, q->by, q->tolerance, q->Y, q->touch, 1, &rep, &back);
            printf("  %-14s %3d %6.0e %8.2f %8.2f %9.2f %6.2f %9.1e %8.1e %6.1f %7.1f %d\n",
                   q->name, side, q->tolerance, 1e3 * plain / FRAMES, 1e3 * taped / FRAMES,
                   1e3 * back / FRAMES, back / plain, rep.residual, rep.early,
                   (double)rep.iterations / FRAMES, 1e-6 * (double)rep.bytes, rep.valid);
            fprintf(csv, "%s,%d,%.0e,%.4f,%.4f,%.4f,%.4f,%.2e,%.2e,%.1f,%.0f\n", q->name, side,
                    q->tolerance, 1e3 * plain / FRAMES, 1e3 * taped / FRAMES, 1e3 * back / FRAMES,
                    back / plain, rep.residual, rep.early, (double)rep.iterations / FRAMES,
                    (double)rep.bytes);
            if (q->by != CLOTH_INTEGRATOR_LEAPFROG && q->tolerance < 1e-6)
                OPEN_MOST(back / plain, 0.5, "backward over forward");
        }
    fclose(csv);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(ratios);
    return TEST_END();
}
