/* kdsm/04_after.c - steps of the kit after a network: what they mend, what they cost, what stays.
 *
 * Notice: a prediction is put on as it is, CLOTH_INITIAL_EXEMPT, though it is stretched, crosses
 * itself and the body; cloth_collide_untangle() and a few steps without memory of speed mend that.
 * They know nothing of the truth, yet cloth that hangs as cloth must is also nearer to it.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/04_after.c -lm
 *   run:      04_after FILE [PREDICTOR [--edge M] [--on GARMENT.obj BODY.obj WEIGHTS.txt MOTION]]
 *             FILE: what 02_data wrote; of the shirt, edges of 0.03 m. PREDICTOR: what 03_learn
 *             wrote; without it one is trained. Without FILE: 20 poses of a coarse shirt
 *   page:     out/04_after.svg
 *   expected: less stretch, fewer intersections, error at most a tenth more: yes
 */
#define KDSM_IMPLEMENTATION
#include "learn.h"
#include "plot.h"
#define STEPS    8
#define UNTANGLE 12         /* calls, at most                                          */

typedef struct sums {       /* over the examples; then the means                       */
    double error, stretch, crossing, inside, seconds;
} sums;

/* The garment as it is now against the truth of example e. */
static const char *measure(lesson *s, int e, double *most, sums *to) {
    const double *x = garment_x(&s->g), *truth = learn_x(s, e);
    int           i, pairs = 0;
    double        worst = 0;
    if (cloth_collide_intersections(s->g.contact, 0, NULL, &pairs)) return "not searched";
    if (cloth_sim_stretches(s->g.sim, NULL, most)) return "no stretches";
    for (i = 0; i < s->g.nf; i++) worst = fmax(worst, most[i]);
    to->error += learn_distance(s->s.nv, x, truth), to->stretch += worst;
    to->crossing += pairs, to->inside += garment_inside(&s->g);
    return NULL;
}

/* Prediction, untangling, steps: rows 0, 1, 2 .. */
static const char *example(lesson *s, int e, const double *said, double *most, sums *row) {
    const double *T = learn_T(s, e);
    const char   *error = garment_wear_at(&s->g, T, said);
    int           i, k;
    if (!error) error = measure(s, e, most, row);
    for (k = 1; k < STEPS + 2 && !error; k++) {
        cloth_untangle_report r;
        const clock_t         t = clock();
        r.after = 1;
        for (i = 0; i < UNTANGLE && r.after > 0; i++)
            if (cloth_collide_untangle(s->g.contact, 0, &r)) break;
        if (k > 1) error = garment_step(&s->g, T, 1);
        row[k].seconds += (double)(clock() - t) / CLOCKS_PER_SEC;
        if (!error) error = measure(s, e, most, row + k);
    }
    return error;
}

/* Each point that has other crossings than the one before says how many. */
static const char *chart(const sums *row) {
    plot      *p = plot_open("After the network: untangled, then steps of 1/60 s",
                             "CPU time an example (s)", "mean error (mm)");
    const int  a = plot_series(p, "mean error; pairs that cross");
    double     t = 0;
    char       text[32];
    int        k;
    for (k = 0; k < STEPS + 2; k++) {
        t += row[k].seconds;
        sprintf(text, "%.1f", row[k].crossing);
        plot_point(p, a, t, 1e3 * row[k].error,
                   k == 0 || fabs(row[k].crossing - row[k - 1].crossing) >= 0.05 ? text : NULL);
    }
    return plot_close(p, "out/04_after.svg");
}

static const char *print_rows(sums *row, int n) {
    const sums *a = row, *b = row + STEPS + 1;
    double      t = 0;
    int         k;
    printf("%d examples that were not learned from; means of each\n"
           "              error mm  worst stretch  crossing  inside  CPU s\n", n);
    for (k = 0; k < STEPS + 2; k++) {
        row[k].error /= n, row[k].stretch /= n, row[k].crossing /= n;
        row[k].inside /= n, row[k].seconds /= n, t += row[k].seconds;
        printf("%-9s %2d  %8.2f %14.2f %9.1f %7.1f %6.2f\n",
               k == 0 ? "predicted" : k == 1 ? "untangled" : "steps", k < 2 ? 0 : k - 1,
               1e3 * row[k].error, row[k].stretch, row[k].crossing,
               row[k].inside, t);
    }
    printf("less stretch, fewer intersections, error at most a tenth more: %s\n",
           b->stretch < a->stretch && b->crossing < a->crossing && b->error < 1.1 * a->error
           ? "yes" : "no");
    return chart(row);
}

static const char *after(lesson *s, predictor *p) {
    sums        row[STEPS + 2];
    double     *most = (double *)malloc((size_t)s->g.nf * sizeof(double));
    const char *error = most ? NULL : "out of memory";
    int         e, n = 0, still = 0;
    memset(row, 0, sizeof row);
    for (e = 0; e < s->s.n; e++)
        still += data_split(s->s.id[e][0]) == 2 && learn_sort(s, e) == LEARN_STILL;
    for (e = 0; e < s->s.n && !error; e++) {
        const double *said;
        if (data_split(s->s.id[e][0]) != 2) continue;
        if (still && learn_sort(s, e) != LEARN_STILL) continue; /* steps would end their swing */
        said = learn_predict(s, p, e);
        error = said ? example(s, e, said, most, row) : "nothing is predicted";
        n++;
    }
    if (!error) error = n > 0 ? print_rows(row, n) : "no example is left for the test";
    free(most);
    return error;
}

static const char *read_arguments(int argc, char **argv, lesson *s, double *edge) {
    int i;
    s->seeds = 1, s->epochs = 120, s->hidden = s->modes = 64;
    *edge = argc > 1 ? 0.03 : 0.05;
    for (i = 3; i < argc; i++) {
        if (!strcmp(argv[i], "--edge") && i + 1 < argc) *edge = atof(argv[++i]);
        else if (!strcmp(argv[i], "--on") && i + 4 < argc) {
            s->on = i + 1;
            break;
        } else return "an option is not known: see the head of 04_after.c";
    }
    return NULL;
}

int main(int argc, char **argv) {
    static lesson    s;
    static predictor p;
    double           edge;
    const char      *error = read_arguments(argc, argv, &s, &edge);
    if (!error && argc < 2) error = learn_own_examples("out/04_");
    if (!error) error = data_read(argc > 1 ? argv[1] : "out/04_data", &s.s);
    if (!error) error = s.on ? figure_load(argv[s.on + 1], argv[s.on + 2], argv[s.on + 3], &s.f)
                             : figure_make(0.03, &s.f);
    if (!error) error = s.on ? garment_load(&s.f, argv[s.on], &s.g)
                             : garment_make(&s.f, edge, &s.g);
    if (!error) error = learn_prepare(&s);
    if (!error) error = argc > 2 ? predictor_read(argv[2], &p)
                                 : learn_train(&s, PREDICT_SPACE, 0, &p);
    if (!error) error = predictor_fits(&p, &s.w);
    if (!error) error = after(&s, &p);
    if (error) fprintf(stderr, "%s\n", error);
    predictor_free(&p), learn_free(&s);
    return error != NULL;
}
