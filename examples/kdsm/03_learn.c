/* kdsm/03_learn.c - a network learns what the joints do to a garment, in two parameterisations.
 *
 * Notice: the same network, data, budget and seeds twice: once for displacements d of the hybrid
 * [6.2], put back by kdsm_place(); once for offsets in frames of the body's surface, the baseline.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/03_learn.c -lm
 *   run:      03_learn FILE [options]             FILE: what 02_data wrote, DIRECTORY/data
 *             --seeds N     trainings of each; 3      --epochs N    120
 *             --hidden N    units a layer; 64         --on GARMENT.obj BODY.obj WEIGHTS.txt ..
 *             without FILE: ten poses of a coarse shirt are made first, and one seed is trained
 *   expected: what was learned is nearer than the mean: yes
 *
 * Input: the rotation of the root, and of every other joint in the root's frame. Both outputs less
 * their means, over their standard deviation. The epoch that is best on the chains that watch is
 * tested; where none watch, on those learned from.
 */
#define KDSM_IMPLEMENTATION
#include "learn.h"

/* What no network can beat that does not look at the pose: the mean of what was learned from. */
static double mean_error(lesson *s, int kind, const double *mean, const double *over) {
    const int n[NET_LAYERS + 1] = {s->inputs, 1, 1, s->outputs};
    double    error;
    net       w;
    if (!net_make(n, 1, &w)) return HUGE_VAL;
    memset(w.p, 0, w.at[NET_LAYERS] * sizeof(double));
    error = learn_judge(s, &w, kind, 2, mean, over);
    net_free(&w);
    return error;
}

static const char *compare(lesson *s) {
    static const char *name[2] = {"space (hybrid)", "body surface"};
    double            *mean = (double *)malloc(4 * (size_t)(s->outputs + s->inputs)
                                               * sizeof(double));
    double             result[2] = {0, 0}, t = (double)clock() / CLOCKS_PER_SEC, *over;
    int                kind, seed, nearer = 1;
    if (!mean) return "out of memory";
    over = mean + s->outputs + s->inputs;
    learn_normalise(s, s->in, s->inputs, 1, mean, over);
    printf("mean error, mm      tested  (seeds)            learned   mean alone\n");
    for (kind = 0; kind < 2; kind++) {
        double known = 0, k = 0, spread = 0, one[16], plain;
        net    w;
        learn_normalise(s, s->out[kind], s->outputs, 0, mean, over);
        for (seed = 0; seed < s->seeds; seed++) {
            one[seed] = 1e3 * learn_train(s, kind, seed, mean, over, &k, &w);
            net_free(&w);
            result[kind] += one[seed] / s->seeds, known += 1e3 * k / s->seeds;
        }
        for (seed = 0; seed < s->seeds; seed++)
            spread += pow(one[seed] - result[kind], 2) / (s->seeds > 1 ? s->seeds - 1 : 1);
        plain = 1e3 * mean_error(s, kind, mean, over);
        nearer &= result[kind] < plain;
        printf("%-16s %9.2f  (deviation %6.3f) %10.2f %12.2f\n", name[kind], result[kind],
               sqrt(spread), known, plain);
    }
    free(mean);
    printf("%.0f s of learning; space / body surface: %.2f (the paper's: about 0.5)\n",
           (double)clock() / CLOCKS_PER_SEC - t, result[0] / result[1]);
    printf("what was learned is nearer than the mean: %s\n", nearer ? "yes" : "no");
    return NULL;
}

/* ----- all of it ---------------------------------------------------------------------- */

static const char *read_arguments(int argc, char **argv, lesson *s) {
    int i;
    s->seeds = argc > 1 ? 3 : 1, s->epochs = 120, s->hidden = 64;
    for (i = 2; i < argc; i++) {
        if (!strcmp(argv[i], "--seeds") && i + 1 < argc) s->seeds = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--epochs") && i + 1 < argc) s->epochs = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--hidden") && i + 1 < argc) s->hidden = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--on") && i + 4 < argc) {
            s->on = i + 1;
            break;
        } else return "an option is not known: see the head of 03_learn.c";
    }
    return s->seeds > 0 && s->seeds <= 16 && s->epochs > 0 && s->hidden > 0 ? NULL
               : "--seeds 1 to 16, --epochs and --hidden from 1";
}

int main(int argc, char **argv) {
    static lesson s;
    const char   *error = read_arguments(argc, argv, &s);
    if (!error && argc < 2) error = learn_own_examples("out/03_");
    if (!error) error = data_read(argc > 1 ? argv[1] : "out/03_data", &s.s);
    if (!error) error = s.on ? figure_load(argv[s.on + 1], argv[s.on + 2], argv[s.on + 3], &s.f)
                             : figure_make(0.03, &s.f);
    if (!error) error = s.on ? garment_load(&s.f, argv[s.on], &s.g)
                             : garment_make(&s.f, argc > 1 ? 0.03 : 0.05, &s.g);
    if (!error) error = learn_prepare(&s);
    if (!error) error = compare(&s);
    if (error) fprintf(stderr, "%s\n", error);
    learn_free(&s);
    return error != NULL;
}
