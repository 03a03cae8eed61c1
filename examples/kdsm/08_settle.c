/* kdsm/08_settle.c - how to bring a garment to rest in a pose: cost against what is left to go.
 *
 * Notice: a set of poses wants cloth that has come to rest. cloth_solve_static() does not know
 * contact, so a garment gets there by steps: of 1/60 s with a little of the speed taken away (what
 * 02_data.c does), of 1/10 s with all of it taken away (as good as statics), or by leapfrog, whose
 * steps are many and know no friction. Friction lets cloth rest in many places: what is drawn is
 * the distance to where 4 s of the first way end. Measured, 4 poses, edges of 0.05 m, ms of CPU and
 * mm: the first way 0.37 after 220, 0.07 after 370; large steps 0.78 after 140, then no nearer;
 * leapfrog 7 after 2100. So 02_data.c goes the first way, 20 to 30 steps at rest.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/08_settle.c -lm
 *   run:      08_settle [EDGE [POSES]]      of the shirt, 0.05 m; poses at random near a walk, 1
 *   page:     out/08_settle.svg
 *   expected: steps of 1/60 s come to within a millimetre of rest: yes
 */
#define KDSM_IMPLEMENTATION
#include "garment.h"
#include "plot.h"
#include <time.h>
#define WAY   20            /* steps of 1/60 s to the pose                              */
#define LONG  240           /* steps of 1/60 s after which all is at rest               */
#define LOOKS 6

typedef struct way {
    const char      *name;
    cloth_integrator integrator;
    double           h, calm;
    int              each, looks;       /* steps from look to look                      */
    double           cost[LOOKS], left[LOOKS];      /* s of CPU, m: means               */
} way;

static way ways[] = {
    {"1/60 s, a tenth of the speed taken", CLOTH_INTEGRATOR_EULER, 1.0 / 60, 0.1, 10, LOOKS,
     {0}, {0}},
    {"1/60 s, all of it", CLOTH_INTEGRATOR_EULER, 1.0 / 60, 1, 10, LOOKS, {0}, {0}},
    {"1/10 s, all of it", CLOTH_INTEGRATOR_EULER, 0.1, 1, 2, LOOKS, {0}, {0}},
    {"leapfrog, a tenth each 1/60 s", CLOTH_INTEGRATOR_LEAPFROG, 1.0 / 60, 0.1, 10, 3, {0}, {0}}};

/* From where it hangs at rest, x, to the joints at the angles `to`: always by the same steps. */
static const char *bring(garment *g, const figure *f, const double *x, const double *to,
                         double *T) {
    const double zero[3 * SHAPES_BONES] = {0};
    const char  *error;
    int          i;
    figure_walk(f, 0, T);
    error = garment_wear_at(g, T, x);
    for (i = 1; i <= WAY && !error; i++) {
        const double t = (double)i / WAY;
        figure_between(f, zero, to, t * t * (3 - 2 * t), T);
        error = garment_step(g, T, 0.1);
    }
    return error;
}

static double apart(const garment *g, const double *x) {
    double sum = 0;
    int    i;
    for (i = 0; i < g->nv; i++) sum += sqrt(kdsmi_distance2(garment_x(g) + 3 * i, x + 3 * i));
    return sum / g->nv;
}

/* One way from `start` on, held against where the long way rests. */
static const char *follow(way *w, garment *g, const double *T, const double *start,
                          const double *rest, int poses) {
    const char *error = garment_again(g, w->integrator);
    clock_t     t;
    int         k, i;
    if (!error) error = garment_wear_at(g, T, start);
    for (t = clock(), k = 0; k < w->looks && !error; k++) {
        for (i = 0; i < w->each && !error; i++) error = garment_step_by(g, T, w->h, w->calm);
        w->cost[k] += (double)(clock() - t) / CLOCKS_PER_SEC / poses;
        w->left[k] += apart(g, rest) / poses;
    }
    return error;
}

static const char *pose(const figure *f, garment *g, const double *hung, uint64_t seed,
                        double *start, double *rest, int poses) {
    const size_t n = 3 * (size_t)g->nv * sizeof(double);
    double       turn[SHAPES_BONES][3], shift[3], to[3 * SHAPES_BONES], T[12 * SHAPES_BONES];
    const char  *error = garment_again(g, CLOTH_INTEGRATOR_EULER);
    size_t       k;
    int          i;
    figure_angles(f, seed, 0.2, to);
    shapes_walk(2 + figure_random(seed, 99), 0, turn, shift);
    for (i = 0; i < 3 * SHAPES_BONES; i++) to[i] += turn[i / 3][i % 3];
    if (!error) error = bring(g, f, hung, to, T);
    memcpy(start, garment_x(g), n);
    if (!error) error = garment_wear_at(g, T, start);       /* as all ways begin */
    for (i = 0; i < LONG && !error; i++) error = garment_step(g, T, 0.1);
    memcpy(rest, garment_x(g), n);
    for (k = 0; k < sizeof ways / sizeof *ways && !error; k++)
        error = follow(ways + k, g, T, start, rest, poses);
    return error;
}

static const char *study(const figure *f, garment *g, int poses) {
    double      T[12 * SHAPES_BONES], *x = (double *)malloc(9 * (size_t)g->nv * sizeof(double));
    const char *error = x ? NULL : "out of memory";
    int         i;
    figure_walk(f, 0, T);
    if (!error) error = garment_wear(g, T);
    for (i = 0; i < 40 && !error; i++) error = garment_step(g, T, 0.1);
    if (!error) memcpy(x, garment_x(g), 3 * (size_t)g->nv * sizeof(double));
    for (i = 0; i < poses && !error; i++)
        error = pose(f, g, x, (uint64_t)i + 1, x + 3 * g->nv, x + 6 * g->nv, poses);
    free(x);
    return error;
}

static const char *chart(int poses) {
    plot  *p = plot_open("A garment comes to rest", "CPU time (s)", "mean distance to rest (mm)");
    size_t k;
    int    i;
    plot_axes(p, 1, 1);
    printf("mean distance to rest, mm, after s of CPU; %d poses\n", poses);
    for (k = 0; k < sizeof ways / sizeof *ways; k++) {
        const int s = plot_series(p, ways[k].name);
        printf("%-36s", ways[k].name);
        for (i = 0; i < ways[k].looks; i++) {
            plot_point(p, s, ways[k].cost[i], 1e3 * ways[k].left[i], NULL);
            printf(" %.2f:%.2f", ways[k].cost[i], 1e3 * ways[k].left[i]);
        }
        printf("\n");
    }
    printf("steps of 1/60 s come to within a millimetre of rest: %s\n",
           ways[0].left[LOOKS - 1] < 1e-3 ? "yes" : "no");
    return plot_close(p, "out/08_settle.svg");
}

int main(int argc, char **argv) {
    figure      f;
    garment     g;
    const int   poses = argc > 2 ? atoi(argv[2]) : 1;
    const char *error = figure_make(0.03, &f);
    memset(&g, 0, sizeof g);
    if (!error) error = garment_make(&f, argc > 1 ? atof(argv[1]) : 0.05, &g);
    if (!error) error = study(&f, &g, poses > 0 ? poses : 1);
    if (!error) error = chart(poses);
    if (error) fprintf(stderr, "%s\n", error);
    garment_free(&g), figure_free(&f);
    return error != NULL;
}
