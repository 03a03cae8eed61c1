/* bench_explicit.c - LEAPFROG: nanoseconds per element and substep, built with three sets of
 * flags; error and CPU time on the peers' scene beside the yardstick.
 *   cc -std=c99 -O3 -march=x86-64-v3 -ffp-contract=off bench/bench_explicit.c -lm && ./a.out
 * The yardstick, and the twins with other flags, are there when 'make -C tests bench' ran;
 * without them those rows are skipped.
 *
 * An element is a triangle or a hinge. 'step': all of cloth_step over the substeps it took;
 * 'force': evaluating all element forces at one position, without the sums per vertex.
 * The scene: 1 m, N = 32, 0.2 kg/m^2, Y = 1000 N/m, nu 0.3, D = 1e-4 N m, two corners held.
 * Error: rms vertex distance from the same scene with 8 times the substeps, largest over the
 * frames (1/60 s) of the first half second.
 *
 * Tried for the forces, ns per element and substep at N = 32, -O3 -march=x86-64-v3, hinge /
 * quadratic; the last lines of each are in the header:
 *     12 numbers stored per hinge, 18 summed corners at a vertex                      13.1 / 8.3
 *     forces per triangle from pulls per hinge, scalar loads of the pulls             10.4 / 8.0
 *     no root and no octants where eight hinges are flat at rest and below 22 degrees;
 *       quadratic pulls as points, loaded like positions                               8.0 / 6.7
 *     stretch from the edges' dot products (hinge only)                                7.65
 * At plain -O2, which has no AVX, the same code takes 12.4 / 11.5.
 * Reserve of substeps: 1.5 costs what m/32 cost (N = 10 to 64: 0.98 to 1.05 of the substeps). None
 * at all: the energy of a sheet of 4 x 4, 3 substeps, swings by 6 % of its motion.
 * Safety: 0.95 takes 0.85 of the substeps of 0.8, but within 120 s sheets of 6 x 6 to 10 x 10 gain
 * 0.23 of their swing in the mean of 12, 0.63 at most, and what shivers 1.0 to 28 times its energy
 * (48 starts; by 0.8 0.98 to 1.04 times). Lost too: 0.85 without a reserve (as larger sheets have
 * it: 0.13 of the swing, at most 0.45; by 0.8 none) and looking at the stretch every 5 substeps.
 * A substep that changes with every frame gains 16 % in 30 s.
 * The scene turns unstable below 52 substeps, 72 are taken: the largest stretch sits at held
 * corners, where the fastest mode is not.
 * Contact over several drifts at once: a sheet of 12 x 12 that fell 5 cm onto a sphere gained 2.5
 * times its weight times its side when contact looked once in 39 substeps, 0.12 of it at every
 * fourth substep (falling on its own side 1.7), and none at every substep.
 */
#define _XOPEN_SOURCE 600
#define CLOTHSIM_IMPLEMENTATION
#include "bench.h"

enum { FRAMES = 30, PASSES = 15, REPEATS = 5 };

static const double H = 1.0 / 60, STIFFNESS = 1e3, RIGIDITY = 1e-4;

static const char *self;

static cloth_desc leapfrog(cloth_bend_model bend, int substeps) {
    cloth_desc d = bench_desc(STIFFNESS, RIGIDITY, 1e-4);
    d.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    d.bend = bend;
    d.substeps = substeps;
    return d;
}

static cloth_bend_model bend_of(const char *name) {
    return *name == 'q' ? CLOTH_BEND_QUADRATIC : *name == 'n' ? CLOTH_BEND_NONE
                                                               : CLOTH_BEND_HINGE;
}

/* ---- children */

/* 'child speed N BEND': ns per element, of a step and of the forces alone. */
static int child_speed(int n, cloth_bend_model bend) {
    cloth_desc     d = leapfrog(bend, 0);
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_report   report;
    cloth_eval     e;
    const double  *extra;
    const cloth_topology *topology;
    double         step[PASSES], force[PASSES], elements;
    int            i, k;
    if (bench_sheet(&d, n, &model, &sim)) return 1;
    topology = cloth_model_topology(model);
    elements = topology->nf + topology->nh;
    for (i = 0; i < 18; i++)                /* 0.3 s: cloth in motion and bent */
        if (cloth_step(sim, H, &report)) return 1;
    for (i = 0; i < PASSES; i++) {
        const double t0 = bench_cpu();
        if (cloth_step(sim, H, &report)) return 1;
        step[i] = 1e9 * (bench_cpu() - t0) / (elements * report.substeps);
    }
    memset(&e, 0, sizeof e);
    e.model = model;
    e.params = cloth_sim_params(sim);
    e.in = &sim->in;
    e.nv = model->nv;
    e.h = H / report.substeps;
    for (i = 0; i < PASSES; i++) {
        const double t0 = bench_cpu();
        for (k = 0; k < 50; k++)
            if (clothi_leap_force(sim, &e, &extra)) return 1;
        force[i] = 1e9 * (bench_cpu() - t0) / (elements * 50);
    }
    printf("%.6g %.6g %d %.0f\n", bench_median(step, PASSES), bench_median(force, PASSES),
           report.substeps, elements);
    bench_free(&model, &sim);
    return 0;
}

/* 'child run N BEND FRAMES': nothing but the steps. */
static int child_run(int n, cloth_bend_model bend, int frames) {
    cloth_desc   d = leapfrog(bend, 0);
    cloth_model *model;
    cloth_sim   *sim;
    cloth_report report;
    long         substeps = 0;
    int          i;
    if (bench_sheet(&d, n, &model, &sim)) return 1;
    for (i = 0; i < frames; i++) {
        if (cloth_step(sim, H, &report)) return 1;
        substeps += report.substeps;
    }
    printf("%ld\n", substeps);
    bench_free(&model, &sim);
    return 0;
}

/* ---- speed */

static int speed_row(FILE *csv, const char *program, const char *flags, const char *bend,
                     const char *n, double *step) {
    const char *argv[6] = {NULL, "child", "speed", NULL, NULL, NULL};
    char        out[256];
    double      force, elements;
    int         substeps;
    argv[0] = program, argv[3] = n, argv[4] = bend;
    if (bench_spawn(argv, out, sizeof out) < 0 ||
        sscanf(out, "%lf %lf %d %lf", step, &force, &substeps, &elements) != 4)
        return 0;
    printf("    N = %s, %-9s  step %6.2f   force %6.2f   (%.0f elements, %d substeps)\n", n, bend,
           *step, force, elements, substeps);
    fprintf(csv, "%s,%s,%s,%.4f,%.4f,%d\n", n, bend, flags, *step, force, substeps);
    return 1;
}

static void speed(void) {
    static const char *const flavour[3] = {"bench", "bench_v3", "bench_o2"};
    FILE *csv = bench_csv("explicit_speed", "n,bend,flags,step_ns,force_ns,substeps");
    int   i, k;
    for (i = 0; i < 3; i++) {
        const char *program = i ? bench_twin(flavour[i], "bench_explicit") : self;
        char        flags[512];
        double      ns[4];
        int         good = 1;
        if (!*program) {
            printf("  skipped: no out/%s/bench/bench_explicit\n", flavour[i]);
            continue;
        }
        bench_flags(program, flags, sizeof flags);
        printf("  ns per element and substep, %s\n", flags);
        for (k = 0; k < 4; k++)
            good &= speed_row(csv, program, flags, k & 1 ? "quadratic" : "hinge",
                              k < 2 ? "32" : "64", &ns[k]);
        CHECK(good);
        printf("  ratio ns of a hinge step, %s: %.2f (aim at most 13)\n", flavour[i],
               fmax(ns[0], ns[2]));
        printf("  ratio ns of a quadratic step, %s: %.2f (aim at most 8)\n", flavour[i],
               fmax(ns[1], ns[3]));
    }
    fclose(csv);
}

/* ---- accuracy */

/* Positions after each frame, [FRAMES][3 nv]; returns the most substeps that a frame took. */
static int trajectory(cloth_bend_model bend, int substeps, double *x) {
    cloth_desc   d = leapfrog(bend, substeps);
    cloth_model *model;
    cloth_sim   *sim;
    cloth_report report;
    int          i, most = 0;
    CHECK(!bench_sheet(&d, 32, &model, &sim));
    for (i = 0; i < FRAMES; i++) {
        CHECK(!cloth_step(sim, H, &report));
        memcpy(x + (size_t)i * 3 * 1024, cloth_sim_state(sim)->x, 3 * 1024 * sizeof *x);
        if (report.substeps > most) most = report.substeps;
    }
    bench_free(&model, &sim);
    return most;
}

static double largest_rms(const double *a, const double *b) {
    double big = 0, rms;
    int    i;
    for (i = 0; i < FRAMES; i++) {
        bench_distance(a + (size_t)i * 3 * 1024, b + (size_t)i * 3 * 1024, 1024, &rms);
        if (!(rms <= big)) big = rms;
    }
    return big;
}

static double run_cpu(const char *program, const char *bend, const char *frames, long *substeps) {
    const char *argv[7] = {NULL, "child", "run", "32", NULL, NULL, NULL};
    char        out[64];
    double      cpu;
    argv[0] = program, argv[4] = bend, argv[5] = frames;
    cpu = bench_spawn(argv, out, sizeof out);
    if (cpu >= 0) *substeps = atol(out);
    return cpu;
}

/* CPU seconds per simulated second of the kit and of the yardstick, interleaved. */
static void race(FILE *csv, const char *flavour, const char *program, const char *bend,
                 double error) {
    double kit[REPEATS], yard[REPEATS], ours, theirs = 0;
    long   substeps = 0, none;
    char   out[1024];
    int    i, have = 1;
    for (i = 0; i < REPEATS; i++) {
        kit[i] = run_cpu(program, bend, "60", &substeps) - run_cpu(program, bend, "0", &none);
        yard[i] = bench_yardstick("32 0 1e3 480 1e-6 1e-1 480 16 3 0 1", out, sizeof out);
        if (yard[i] < 0) have = 0;
        else yard[i] -= bench_yardstick("32 0 1e3 0 1e-6 1e-1 480 16 3 0 1", out, sizeof out);
    }
    ours = bench_median(kit, REPEATS);
    printf("  %-9s %-9s CPU %.4f s (%.4f-%.4f) a simulated second, %ld substeps", flavour, bend,
           ours, kit[0], kit[REPEATS - 1], substeps);
    if (have) {
        theirs = bench_median(yard, REPEATS);
        printf("; yardstick %.4f (%.4f-%.4f)\n", theirs, yard[0], yard[REPEATS - 1]);
        printf("  ratio kit / yardstick, %s, %s: %.2f (aim at most 0.4)\n", flavour, bend,
               ours / theirs);
    } else printf("\n  skipped: no out/bench/yardstick\n");
    fprintf(csv, "%s,%s,%.6f,%.6f,%.4g\n", flavour, bend, ours, theirs, error);
}

static void peers_scene(void) {
    static const char *const flavour[2] = {"bench", "bench_v3"};
    static const char *const bends[3] = {"hinge", "quadratic", "none"};
    FILE   *csv = bench_csv("explicit_scene", "flavour,bend,kit_cpu_s,yardstick_cpu_s,error_m");
    const size_t n = (size_t)FRAMES * 3 * 1024;
    double *x[3], *hinge = (double *)bench_get(n, sizeof *hinge);
    int     i, k;
    for (i = 0; i < 3; i++) x[i] = (double *)bench_get(n, sizeof **x);
    for (k = 0; k < 3; k++) {
        const int m = trajectory(bend_of(bends[k]), 0, x[0]);
        double    error;
        (void)trajectory(bend_of(bends[k]), 4 * m, x[1]);
        (void)trajectory(bend_of(bends[k]), 8 * m, x[2]);
        error = largest_rms(x[0], x[2]);
        if (k == 0) memcpy(hinge, x[2], n * sizeof *hinge);
        printf("  %-9s error at %d substeps a frame %.2e m, at 4 times as many %.2e m "
               "(rms, first half second)\n", bends[k], m, error, largest_rms(x[1], x[2]));
        if (k == 0) printf("  ratio error of leapfrog, hinge: %.2e (aim at most 5e-4)\n", error);
        else printf("  %-9s as a model: %.2e m from hinge\n", bends[k], largest_rms(x[2], hinge));
        CHECK(error <= 5e-4);
        for (i = 0; i < 2; i++) {
            const char *program = i ? bench_twin(flavour[i], "bench_explicit") : self;
            if (*program) race(csv, flavour[i], program, bends[k], error);
        }
    }
    for (i = 0; i < 3; i++) free(x[i]);
    free(hinge);
    fclose(csv);
}

int main(int argc, char **argv) {
    if (argc == 5 && !strcmp(argv[2], "speed")) return child_speed(atoi(argv[3]), bend_of(argv[4]));
    if (argc == 6 && !strcmp(argv[2], "run"))
        return child_run(atoi(argv[3]), bend_of(argv[4]), atoi(argv[5]));
    self = argv[0];
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(speed);
    RUN(peers_scene);
    return TEST_END();
}
