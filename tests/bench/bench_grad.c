/* bench_grad.c - what a derivative costs, and how good it is: a run forwards, its tape backwards,
 * in one program, by CPU time; all causes are asked for. Also what a tape costs the forward run.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_grad.c -lm && ./a.out
 * The hanging sheet, free and on a sphere, Y = 1e4 N/m, D = 3e-5 N m, h = 1/60 s, forward to 1e-8 m
 * (LEAPFROG: Y = 1e3 N/m), adjoint to a residual of 1e-8. Aim: backward at most 0.5 of forward.
 *
 * tolerances: the same at N = 32 over the tolerance of the steps. A step that stops early is a
 * minimum of something else: the gradient's error is its relative distance from the one at 1e-10 m,
 * by the initial positions and by the stretch moduli; 'told' is the report's own estimate of it.
 * The one at 1e-10 m, free, is itself compared with central differences of such runs by the moduli;
 * on the sphere differences over 20 steps say nothing, of any width from 1e-4 to 1e-7: contacts and
 * their sticking change in between (steps of it: tests/test_grad_contact.c).
 * What the elements' numbers at rest are worth is summed in lanes, together with H u, and carried
 * to X, moduli and D once: LEAPFROG 17.3 of forward before, 4.4 now. What lost, N = 32 and 64: a
 * factor that serves every second step and CG with it (141 to 3221 iterations; a factorisation
 * costs as much as 5), and CG with SGS, forward's own solver (190 to 300 iterations, 1.1 to 1.5 of
 * forward: no start from the last step's solution could save three of four).
 * A sim without a tape pays nothing: 8 steps of 32 x 32 take 513.69 million instructions where
 * clothsim_grad.h is not included, 513.66 where it is or a tape has gone; LEAPFROG's 382.46 each
 * way (callgrind).
 * Charts: out/bench/grad_ratio.svg, grad_error.svg. */
#define _XOPEN_SOURCE 600
#include "../../clothsim_collide.h"
#include "../../clothsim_grad.h"
#include "../../examples/plot.h"
#include "bench.h"

enum { FRAMES = 20 };
#define DIFF 1e-4                           /* of the moduli: half of a central difference     */

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

typedef struct scene {                      /* a row of the tables, and how to run it          */
    const char      *name;
    cloth_integrator by;
    double           tolerance, Y;
    int              touch, side;
} scene;

/* A sphere under the middle of the sheet. */
static cloth_collide *sphere(cloth_sim *sim) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    const double        at[3] = {0.5, -0.3, 0.5};
    cloth_collide      *c = NULL;
    d.kind = CLOTH_OBSTACLE_SPHERE;
    d.x = at;
    d.radius = 0.29;
    CHECK(!cloth_collide_create(sim, NULL, &c) && !cloth_collide_add(c, &d, NULL));
    return c;
}

/* The sheet, Y in N/m, and its sphere; NULL: none. */
static cloth_collide *scene_make(const scene *q, double Y, cloth_model **model, cloth_sim **sim) {
    cloth_desc d = bench_desc(Y, 3e-5, q->tolerance);
    d.integrator = q->by;
    if (q->touch) d.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(!bench_sheet(&d, q->side, model, sim));
    return q->touch ? sphere(*sim) : NULL;
}

/* Where every run begins, [2 x nv x 3] x and v: on the sphere the sheet lies by then. */
static double *scene_start(scene q) {
    cloth_model       *model;
    cloth_sim         *sim;
    cloth_collide     *c;
    const cloth_state *s;
    const size_t       n = 3 * (size_t)q.side * (size_t)q.side;
    double            *x = (double *)bench_get(2 * n, sizeof *x);
    int                k;
    q.tolerance = 1e-8;
    c = scene_make(&q, q.Y, &model, &sim);
    for (k = 0; k < (q.touch ? 13 : 1); k++) CHECK(!cloth_step(sim, 1.0 / 60, NULL));
    s = cloth_sim_state(sim);
    memcpy(x, s->x, n * sizeof *x), memcpy(x + n, s->v, n * sizeof *x);
    cloth_collide_destroy(c), bench_free(&model, &sim);
    return x;
}

static void scene_place(cloth_sim *sim, const double *x) {
    const size_t n = 3 * (size_t)cloth_sim_params(sim)->nv;
    cloth_state *s = cloth_sim_state(sim);
    memcpy(s->x, x, n * sizeof *x), memcpy(s->v, x + n, n * sizeof *x);
    cloth_sim_state_changed(sim);
}

/* The loss alone, at the moduli times 1 + by; its value. */
static double loss_of(const scene *q, double by, const double *x) {
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c = scene_make(q, q->Y * (1 + by), &model, &sim);
    double         loss = 0;
    int            k;
    scene_place(sim, x);
    for (k = 0; k < FRAMES; k++) CHECK(!cloth_step(sim, 1.0 / 60, NULL));
    for (k = 0; k < 3 * cloth_sim_params(sim)->nv; k++)
        loss += 0.5 * pow(cloth_sim_state(sim)->x[k] - 0.5, 2);
    cloth_collide_destroy(c);
    bench_free(&model, &sim);
    return loss;
}

/* CPU s of the run from x; with a tape also of its way back, and its derivatives, to be freed. */
static double forward(const scene *q, const double *x, int tape, cloth_grad_report *rep,
                      double *back, outputs *out) {
    cloth_tape_options o = cloth_tape_options_default();
    cloth_model       *model;
    cloth_sim         *sim;
    cloth_tape        *t = NULL;
    cloth_collide     *c = scene_make(q, q->Y, &model, &sim);
    double             t0, cpu;
    int                k;
    o.tolerance = 1e-8;
    scene_place(sim, x);
    CHECK(!cloth_step(sim, 1.0 / 60, NULL));            /* allocations */
    scene_place(sim, x);
    if (tape) CHECK(!cloth_tape_create(sim, &o, &t));
    t0 = bench_cpu();
    for (k = 0; k < FRAMES; k++) CHECK(!cloth_step(sim, 1.0 / 60, NULL));
    cpu = bench_cpu() - t0;
    if (tape) {
        const cloth_params *p = cloth_sim_params(sim);
        end_loss            u = {FRAMES, p->nv};
        *out = outputs_make(p->nv, p->nf, p->nh);
        t0 = bench_cpu();
        CHECK(!cloth_grad_backward(t, at_end, &u, &out->g, rep));
        *back = bench_cpu() - t0;
    }
    cloth_tape_destroy(t);
    cloth_collide_destroy(c);
    bench_free(&model, &sim);
    return cpu;
}

static void ratios(void) {
    static const scene rows[] = {
        {"EULER", CLOTH_INTEGRATOR_EULER, 1e-8, 1e4, 0, 0},
        {"BDF2", CLOTH_INTEGRATOR_BDF2, 1e-8, 1e4, 0, 0},
        {"EULER, sphere", CLOTH_INTEGRATOR_EULER, 1e-8, 1e4, 1, 0},
        {"BDF2, sphere", CLOTH_INTEGRATOR_BDF2, 1e-8, 1e4, 1, 0},
        {"EULER", CLOTH_INTEGRATOR_EULER, 1e-4, 1e4, 0, 0},
        {"EULER, sphere", CLOTH_INTEGRATOR_EULER, 1e-4, 1e4, 1, 0},
        {"LEAPFROG", CLOTH_INTEGRATOR_LEAPFROG, 1e-8, 1e3, 0, 0}};
    FILE *csv = bench_csv("grad", "scene,side,tolerance_m,forward_ms,taped_ms,backward_ms,ratio,"
                                  "residual,early,directions,bytes");
    int   i, side;
    printf("  %-14s %3s %6s %8s %8s %9s %6s %9s %8s %6s %7s %s\n", "", "N", "tol m", "fwd ms",
           "taped", "backward", "ratio", "residual", "early", "GCR", "MB", "valid");
    for (i = 0; i < (int)(sizeof rows / sizeof *rows); i++)
        for (side = 32; side <= 64; side *= 2) {
            scene             q = rows[i];
            cloth_grad_report rep;
            outputs           out;
            double            back = 0, plain, taped, *x;
            q.side = side;
            x = scene_start(q);
            plain = forward(&q, x, 0, &rep, &back, NULL);
            taped = forward(&q, x, 1, &rep, &back, &out);
            printf("  %-14s %3d %6.0e %8.2f %8.2f %9.2f %6.2f %9.1e %8.1e %6.1f %7.1f %d\n",
                   q.name, side, q.tolerance, 1e3 * plain / FRAMES, 1e3 * taped / FRAMES,
                   1e3 * back / FRAMES, back / plain, rep.residual, rep.early,
                   (double)rep.iterations / FRAMES, 1e-6 * (double)rep.bytes, rep.valid);
            fprintf(csv, "%s,%d,%.0e,%.4f,%.4f,%.4f,%.4f,%.2e,%.2e,%.1f,%.0f\n", q.name, side,
                    q.tolerance, 1e3 * plain / FRAMES, 1e3 * taped / FRAMES, 1e3 * back / FRAMES,
                    back / plain, rep.residual, rep.early, (double)rep.iterations / FRAMES,
                    (double)rep.bytes);
            if (q.by != CLOTH_INTEGRATOR_LEAPFROG && q.tolerance < 1e-6)
                OPEN_MOST(back / plain, 0.5, "backward over forward");
            free(out.block), free(x);
        }
    fclose(csv);
}

/* One scene over the tolerance of its steps, in both charts. */
static void over_tolerance(const scene *at, plot *ratio, plot *error, FILE *csv) {
    static const double tolerance[] = {1e-10, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2};
    scene               q = *at;
    outputs             best, out;
    const int           n = 3 * q.side * q.side, r = plot_series(ratio, q.name);
    const int           e = plot_series(error, q.name);
    double             *x = scene_start(q), by = 0;
    int                 i, k;
    for (i = 0; i < (int)(sizeof tolerance / sizeof *tolerance); i++) {
        cloth_grad_report rep;
        double            back, cpu, off = 0, all = 0, moduli;
        q.tolerance = tolerance[i];
        cpu = forward(&q, x, 1, &rep, &back, i ? &out : &best);
        if (i == 0) out = best, by = *best.g.membrane;
        if (i == 0 && !q.touch)
            by = (loss_of(&q, DIFF, x) - loss_of(&q, -DIFF, x)) / (2 * DIFF * q.Y);
        for (k = 0; k < n; k++)
            off += pow(out.g.x0[k] - best.g.x0[k], 2), all += pow(best.g.x0[k], 2);
        off = sqrt(off / all);
        moduli = fabs(*out.g.membrane - (i ? *best.g.membrane : by)) / fabs(*best.g.membrane);
        if (i == 0) CHECK(moduli < 1e-4);
        printf("  %-14s %6.0e %8.2f %6.2f %9.1e %9.1e %9.1e %d%s\n", q.name, q.tolerance,
               1e3 * cpu / FRAMES, back / cpu, off, moduli, rep.early, rep.valid,
               i || q.touch ? "" : "  (moduli: from differences)");
        fprintf(csv, "%s,%.0e,%.4f,%.4f,%.3e,%.3e,%.3e,%d\n", q.name, q.tolerance,
                1e3 * cpu / FRAMES, back / cpu, off, moduli, rep.early, rep.valid);
        plot_point(ratio, r, q.tolerance, back / cpu, NULL);
        if (i) plot_point(error, e, q.tolerance, off, NULL);
        if (i) free(out.block);
    }
    free(best.block), free(x);
}

static void tolerances(void) {
    static const scene rows[] = {{"EULER", CLOTH_INTEGRATOR_EULER, 0, 1e4, 0, 32},
                                 {"BDF2", CLOTH_INTEGRATOR_BDF2, 0, 1e4, 0, 32},
                                 {"EULER, sphere", CLOTH_INTEGRATOR_EULER, 0, 1e4, 1, 32},
                                 {"BDF2, sphere", CLOTH_INTEGRATOR_BDF2, 0, 1e4, 1, 32}};
    const char *const  x = "tolerance of a step (m)";
    plot              *ratio = plot_open("Cost of a derivative", x, "backward over forward, CPU");
    plot              *error = plot_open("Error of a derivative", x, "relative, by positions");
    FILE              *csv = bench_csv("grad_tolerance", "scene,tolerance_m,forward_ms,ratio,error,"
                                                         "error_moduli,told,valid");
    int                i;
    plot_axes(ratio, 1, 0), plot_axes(error, 1, 1);
    printf("  %-14s %6s %8s %6s %9s %9s %9s %s\n", "N = 32", "tol m", "fwd ms", "ratio", "error",
           "moduli's", "told", "valid");
    for (i = 0; i < (int)(sizeof rows / sizeof *rows); i++)
        over_tolerance(rows + i, ratio, error, csv);
    plot_hline(ratio, 0.5, "aim at 1e-8 m");
    fclose(csv);
    CHECK(plot_close(ratio, "out/bench/grad_ratio.svg") == NULL);
    CHECK(plot_close(error, "out/bench/grad_error.svg") == NULL);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(ratios);
    RUN(tolerances);
    return TEST_END();
}
