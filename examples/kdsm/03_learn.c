/* kdsm/03_learn.c - a network learns what joints do to a garment, in three parameterisations.
 *
 * Notice: the same network, data, budget and seeds three times: for displacements d of the hybrid
 * [6.2], put back by kdsm_place(); for offsets in frames of the body's surface; for those of method
 * 2. What was learned of the first is written, read again, and dressed in a walk: left simulated,
 * right predicted.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/03_learn.c -lm
 *   run:      03_learn FILE [options]             FILE: what 02_data wrote, DIRECTORY/data
 *             --seeds N     trainings of each; 3      --epochs N    100
 *             --hidden N    units a layer; 128        --edge M      of the shirt; 0.03
 *             --few N       learn from chains below N; all
 *             --walk S      seconds of it; 2          --rest N      settled too, by N steps; 0
 *             --modes N     of the outputs; 64        --skeleton FILE    of --on's body, for --rest
 *             --on GARMENT.obj BODY.obj WEIGHTS.txt MOTION
 *             FILE.net is the predictor. Without FILE: 20 poses of a coarse shirt are made first
 *   page:     out/03_learn.html
 *   expected: what was learned is nearer than the mean: yes
 *
 * Input: the rotation of the root, and of every other joint in the root's frame, as axis times
 * angle, and how fast they turn (predict.h). Outputs less their means, over their deviation, in
 * their largest modes. The epoch that is best on the chains that watch is tested; where none
 * watch, on those learned from. Given up: what a parameterisation does not give back of the truth.
 * Volume: of the garment, its openings closed by fans: |V - true V| over that.
 * Unsteady: the root mean square of x(t+h) - 2 x(t) + x(t-h) over the walk, h = 1/60 s. Jitter: how
 * far a frame is from a smooth motion, by fourth differences.
 *
 * Measured, edges of 0.05 m, of 02_data --edge 0.05 --poses 1 --steps 60 --around 0.05; tested, the
 * hybrid's mean error, and that over method 2's; 3 seeds, and the deviation of one:
 *     --chains 200                  2.33 +- 0.025 mm, 0.52    (one network, no modes)
 *     --chains 400                  1.98 +- 0.030 mm, 0.471; volume 0.59
 *     --chains 1600                 1.42 +- 0.022 mm, 0.369; volume 0.48
 *     --chains 3200                 1.33 +- 0.014 mm, 0.351; volume 0.54 (of 320 poses, not 160)
 *     --chains 1600 --moves 300, and here --modes 160 --rest 60:
 *       settled                     1.33 +- 0.014 mm, 0.350; volume 0.48
 *       2 s of walk, settled        2.25 mm, 0.48; volume 0.47; jitter 0.39
 *       motions from their start    4.13 +- 0.026 mm, 0.71; volume 0.79    (25 motions: 5.62, 0.78)
 *       2 s of walk as it moves     4.17 mm, 0.73; volume 0.63; jitter 0.74; unsteady beyond what
 *                                   is true 0.62, by every other frame 0.40; by settled poses
 *                                   alone 12 mm
 *     motions of 300 steps          5.07 mm, 0.79 (1 seed); their second half alone 5.62, 0.82
 *     400 chains of --around 0.2    4.50 mm, 0.80 (1 seed); of all that a person can 17.4, 0.92
 * From 1600 poses on the error is that of the truth: frames of the walk that settle from rest are
 * 1.3 mm off a smooth motion and 0.17 % in volume, since friction lets cloth rest in many places.
 * 256 units, 200 epochs, half the rate, a sixth of the decay: within 0.1 mm. More decay for
 * motions, by their number, not that of their examples: 4.36 for 4.18 mm.
 * Method 2 gives up 3.3 mm whatever is learned; what comes on top is of poses not learned from,
 * alike in all three: so the ratio falls as the poses are learned better. Against the frames, which
 * give nothing up, it is 0.99: to learn well no space round the body is needed where offsets turn
 * with the surface. A cycle of the walk apart, the shirt is 11 mm from where it was at 2 s, 2 at 3,
 * 1 at 4: at first it hangs as the walk began, which no joints tell.
 */
#define KDSM_IMPLEMENTATION
#include "learn.h"
#include "view.h"
#define DRAW  4             /* steps of 1/60 s from picture to picture of the walk      */
#define SEEDS 16
#define APART 1.3           /* m                                                        */

static const char *const kind_name[PREDICT_KINDS] = {"space (hybrid)", "surface, frames",
                                                     "surface, method 2"};

typedef struct school {     /* what was learned, and how it did                         */
    predictor of[PREDICT_KINDS][SEEDS], plain[PREDICT_KINDS];
    double    error[PREDICT_KINDS][LEARN_SORTS][SEEDS];     /* mm, tested                */
    double    mean[PREDICT_KINDS][LEARN_SORTS];             /* over the seeds            */
    double    volume[PREDICT_KINDS][LEARN_SORTS];           /* %                         */
    double    nothing[PREDICT_KINDS];                       /* mm, untaught              */
    int       count[LEARN_SORTS];
} school;

typedef struct steady {     /* a garment along the walk                                 */
    double *x[5];           /* the last frames, the newest first                        */
    double  error, volume, second, fourth;  /* sums                                     */
    int     n;              /* frames                                                   */
} steady;

typedef struct stroll {
    double length;          /* s                                                        */
    int    rest;            /* steps to each frame at rest; 0: only as it moves         */
    view  *v;               /* or NULL                                                  */
    int    mesh[4];
    const char *skeleton;
} stroll;

static double since(clock_t start) { return (double)(clock() - start) / CLOCKS_PER_SEC; }

/* ----- trained and tested ------------------------------------------------------------- */

/* The deviation of a seed from the mean. */
static double spread(const double *a, int n, double mean) {
    double sum = 0;
    int    i;
    for (i = 0; i < n; i++) sum += pow(a[i] - mean, 2) / (n > 1 ? n - 1 : 1);
    return sqrt(sum);
}

static const char *study(lesson *s, school *c, int kind) {
    const char *error = learn_mean(s, kind, 1, &c->plain[kind]);
    double      known = 0;
    marks       m;
    int         i, k;
    if (!error) error = learn_judge(s, &c->plain[kind], 2, LEARN_ALL, &m);
    if (error) return error;
    c->nothing[kind] = 1e3 * m.error[LEARN_ALL];
    for (i = 0; i < s->seeds; i++) {
        error = learn_train(s, kind, i, &c->of[kind][i]);
        if (!error) error = learn_judge(s, &c->of[kind][i], 0, LEARN_ALL, &m);
        known += 1e3 * m.error[LEARN_ALL] / s->seeds;
        if (!error) error = learn_judge(s, &c->of[kind][i], 2, LEARN_ALL, &m);
        if (error) return error;
        for (k = 0; k < LEARN_SORTS; k++) {
            c->error[kind][k][i] = 1e3 * m.error[k], c->count[k] = m.count[k];
            c->mean[kind][k] += 1e3 * m.error[k] / s->seeds;
            c->volume[kind][k] += 100 * m.volume[k] / s->seeds;
        }
    }
    printf("%-18s", kind_name[kind]);
    for (k = LEARN_STILL; k < LEARN_SORTS; k++)
        printf("%8.2f +-%5.3f %5.2f", c->mean[kind][k],
               spread(c->error[kind][k], s->seeds, c->mean[kind][k]), c->volume[kind][k]);
    printf("%9.2f %9.2f %8.2f\n", known, c->nothing[kind], 1e3 * s->lost[kind]);
    fflush(stdout);
    return NULL;
}

static const char *compare(lesson *s, school *c) {
    static const char *const sort[LEARN_SORTS] = {"all", "settled", "moving"};
    const clock_t start = clock();
    const char   *error = NULL;
    int           k;
    printf("tested             settled: mm    vol %%   moving: mm    vol %%  learned  the mean's "
           "given up\n");
    for (k = 0; k < PREDICT_KINDS && !error; k++) error = study(s, c, k);
    if (error) return error;
    printf("%.0f s of learning, %d seeds; space over surface by method 2 (the paper's: about 0.5), "
           "by frames:\n", since(start), s->seeds);
    for (k = 0; k < LEARN_SORTS; k++)
        if (c->count[k])
            printf("  %-8s %3d examples: error %.3f, %.2f; volume %.2f, %.2f\n", sort[k],
                   c->count[k], c->mean[0][k] / c->mean[2][k], c->mean[0][k] / c->mean[1][k],
                   c->volume[0][k] / c->volume[2][k], c->volume[0][k] / c->volume[1][k]);
    return NULL;
}

/* ----- the walk ----------------------------------------------------------------------- */

/* x is the newest frame of w, truth that of what is true. */
static void follow(const lesson *s, steady *w, const double *x, const double *truth) {
    double **y = w->x, *last = y[4], v = learn_volume(s, truth);
    int      i;
    for (i = 4; i > 0; i--) y[i] = y[i - 1];
    y[0] = last;
    memcpy(last, x, (size_t)s->outputs * sizeof(double));
    w->error += learn_distance(s->s.nv, x, truth);
    w->volume += fabs(learn_volume(s, x) - v) / fabs(v);
    w->n++;
    for (i = 0; i < s->outputs && w->n >= 3; i++)
        w->second += pow(y[0][i] - 2 * y[1][i] + y[2][i], 2) / s->s.nv;
    for (i = 0; i < s->outputs && w->n >= 5; i++)
        w->fourth += pow(y[0][i] - 4 * y[1][i] + 6 * y[2][i] - 4 * y[3][i] + y[4][i], 2) / s->s.nv;
}

static void shift(double *x, int n, double by) {
    int i;
    for (i = 0; i < n; i++) x[3 * i] += by;
}

/* All predictors of all seeds and the truth as it is now. steady: the truth's, then theirs. */
static const char *walk_frame(lesson *s, school *c, steady *w, const double *T,
                              const double *before, view *v, const int *mesh) {
    const double *truth = garment_x(&s->g);
    const char   *error = NULL;
    int           k, i;
    follow(s, w, truth, truth);
    view_put(v, mesh[0], s->g.body, NULL, NULL), view_put(v, mesh[1], truth, NULL, NULL);
    for (k = 0; k < PREDICT_KINDS; k++)
        for (i = 0; i < s->seeds; i++) {
            error = predict(&s->w, &c->of[k][i], T, before, s->x);
            if (error) return error;
            follow(s, w + 1 + k * SEEDS + i, s->x, truth);
            if (k || i || !v) continue;
            shift(s->x, s->s.nv, APART), view_put(v, mesh[3], s->x, NULL, NULL);
        }
    memcpy(s->w.body, s->g.body, 3 * (size_t)s->f.nv * sizeof(double));
    shift(s->w.body, s->f.nv, APART), view_put(v, mesh[2], s->w.body, NULL, NULL);
    return NULL;
}

/* Root mean squares, mm: of second differences; how far a frame is from a smooth motion, whose
 * fourth differences are 0: those of noise of 1 are sqrt 70. */
static double unsteady(const steady *w) { return 1e3 * sqrt(w->second / (w->n - 2)); }

static double jitter(const steady *w) { return 1e3 * sqrt(w->fourth / (w->n - 4) / 70); }

static void walk_print(const lesson *s, const steady *w, const char *name) {
    const double truth = unsteady(w);
    double       sum[PREDICT_KINDS][4];     /* mm, %, mm, mm: means over the seeds */
    int          k, i;
    printf("%-18s   error mm   volume %%   unsteady mm     jitter mm\n"
           "true                                  %10.3f    %10.3f\n", name, truth, jitter(w));
    memset(sum, 0, sizeof sum);
    for (k = 0; k < PREDICT_KINDS; k++) {
        for (i = 0; i < s->seeds; i++) {
            const steady *one = w + 1 + k * SEEDS + i;
            sum[k][0] += 1e3 * one->error / one->n / s->seeds;
            sum[k][1] += 100 * one->volume / one->n / s->seeds;
            sum[k][2] += unsteady(one) / s->seeds;
            sum[k][3] += jitter(one) / s->seeds;
        }
        printf("%-18s %10.2f %10.2f    %10.3f    %10.3f\n", kind_name[k], sum[k][0], sum[k][1],
               sum[k][2], sum[k][3]);
    }
    printf("space over surface by method 2: error %.2f, volume %.2f, unsteady beyond what is true "
           "%.2f, jitter %.2f\n",
           sum[0][0] / sum[2][0], sum[0][1] / sum[2][1],
           fabs(sum[0][2] - truth) / fabs(sum[2][2] - truth), sum[0][3] / sum[2][3]);
}

/* From where it hangs at rest, simulated; each frame compared. T: joints now and a step before. */
static const char *walk_moving(lesson *s, school *c, steady *w, const stroll *how, double *T) {
    const size_t n = 12 * (size_t)s->s.njoints;
    const int    last = (int)(how->length / GARMENT_H + 0.5);
    const char  *error;
    int          i;
    figure_walk(&s->f, 0, T);
    error = garment_wear_at(&s->g, T, s->s.u);
    for (i = 1; i <= last && !error; i++) {
        memcpy(T + n, T, n * sizeof(double));
        figure_walk(&s->f, i * GARMENT_H, T);
        error = garment_step(&s->g, T, 0.1);
        if (error || i < last / 4) continue;    /* the start is not yet a walk */
        if (i % DRAW == 0) view_time(how->v, i * GARMENT_H);
        error = walk_frame(s, c, w, T, T + n, i % DRAW ? NULL : how->v, how->mesh);
    }
    return error;
}

/* The same frames, each settled from rest, as examples are. */
static const char *walk_resting(lesson *s, school *c, steady *w, const stroll *how, double *T) {
    const int   last = (int)(how->length / GARMENT_H + 0.5);
    const char *error = NULL;
    double      from[3 * 1000], to[3 * 1000];
    int         i;
    memset(from, 0, sizeof from);
    for (i = last / 4; i <= last && !error; i++) {
        if (!figure_walk_angles(&s->f, i * GARMENT_H, to)) return "--rest wants --skeleton";
        figure_walk(&s->f, 0, T);
        error = garment_wear(&s->g, T);
        if (!error) error = garment_bring(&s->g, from, to, how->rest, T);
        if (!error) error = walk_frame(s, c, w, T, T, NULL, how->mesh);
    }
    return error;
}

static const char *walk(lesson *s, school *c, const stroll *how, int resting) {
    static steady w[1 + PREDICT_KINDS * SEEDS];
    const size_t  n = sizeof w / sizeof *w, no = (size_t)s->outputs;
    double       *x = (double *)calloc(5 * n * no + 24 * (size_t)s->s.njoints, sizeof(double));
    const char   *error;
    size_t        i;
    if (!x) return "out of memory";
    memset(w, 0, sizeof w);
    for (i = 0; i < 5 * n; i++) w[i / 5].x[i % 5] = x + i * no;
    error = resting ? walk_resting(s, c, w, how, x + 5 * n * no)
                    : walk_moving(s, c, w, how, x + 5 * n * no);
    if (!error && w->n > 4) walk_print(s, w, resting ? "the walk, settled" : "the walk");
    free(x);
    return error;
}

static const char *walks(lesson *s, school *c, stroll *how, int draw) {
    const char *error, *wrong = NULL;
    int         m;
    how->v = draw ? view_open("What a network says of a shirt",
                              "Left simulated; right predicted from the joints alone.") : NULL;
    for (m = 0; m < 4 && how->v; m++)
        how->mesh[m] = m % 2 ? view_mesh(how->v, m == 1 ? "simulated" : "predicted", VIEW_CLOTH,
                                         s->g.nv, s->g.nf, s->g.faces)
                             : view_mesh(how->v, m ? "body too" : "body", VIEW_OBSTACLE, s->f.nv,
                                         s->f.nf, s->f.faces);
    view_camera(how->v, 0, 4);
    error = walk(s, c, how, 0);
    if (how->v) wrong = view_close(how->v, "out/03_learn.html");
    if (!error && how->rest > 0) error = walk(s, c, how, 1);
    return error ? error : wrong;
}

/* ----- all of it ---------------------------------------------------------------------- */

/* The hybrid's, to a file and back: it is this one that walks. */
static const char *keep(school *c, const wearer *w, const char *data) {
    char        path[1000];
    const char *error;
    predictor  *p = &c->of[PREDICT_SPACE][0];
    sprintf(path, "%.900s.net", data);
    error = predictor_write(path, p);
    predictor_free(p);
    if (!error) error = predictor_read(path, p);
    if (!error) error = predictor_fits(p, w);
    if (!error)
        printf("%s: %d joints to %d vertices, %d numbers\n", path, p->njoints, p->nv,
               (int)(p->still.at[NET_LAYERS] + p->swing.at[NET_LAYERS]));
    return error;
}

static const char *read_arguments(int argc, char **argv, lesson *s, double *edge, stroll *how) {
    int i;
    s->seeds = argc > 1 ? 3 : 1, s->epochs = argc > 1 ? 100 : 120;
    s->hidden = argc > 1 ? 128 : 64, s->modes = 64;
    *edge = argc > 1 ? 0.03 : 0.05, how->length = 2;
    for (i = 2; i < argc; i++) {
        if (!strcmp(argv[i], "--seeds") && i + 1 < argc) s->seeds = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--epochs") && i + 1 < argc) s->epochs = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--hidden") && i + 1 < argc) s->hidden = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--modes") && i + 1 < argc) s->modes = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--few") && i + 1 < argc) s->few = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--edge") && i + 1 < argc) *edge = atof(argv[++i]);
        else if (!strcmp(argv[i], "--walk") && i + 1 < argc) how->length = atof(argv[++i]);
        else if (!strcmp(argv[i], "--rest") && i + 1 < argc) how->rest = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--skeleton") && i + 1 < argc) how->skeleton = argv[++i];
        else if (!strcmp(argv[i], "--on") && i + 4 < argc) {
            s->on = i + 1;
            break;
        } else return "an option is not known: see the head of 03_learn.c";
    }
    return s->seeds > 0 && s->seeds <= SEEDS && s->epochs > 0 && s->hidden > 0 && s->modes > 0
               ? NULL : "--seeds 1 to 16, --epochs, --hidden and --modes from 1";
}

int main(int argc, char **argv) {
    static lesson s;
    static school c;
    const char   *path = argc > 1 ? argv[1] : "out/03_data";
    static stroll how;
    double        edge;
    int           k, i, nearer = 1;
    const char   *error = read_arguments(argc, argv, &s, &edge, &how);
    if (!error && argc < 2) error = learn_own_examples("out/03_");
    if (!error) error = data_read(path, &s.s);
    if (!error) error = s.on ? figure_load(argv[s.on + 1], argv[s.on + 2], argv[s.on + 3], &s.f)
                             : figure_make(0.03, &s.f);
    if (!error && how.skeleton) error = figure_read_skeleton(how.skeleton, &s.f);
    if (!error) error = s.on ? garment_load(&s.f, argv[s.on], &s.g)
                             : garment_make(&s.f, edge, &s.g);
    if (!error) error = learn_prepare(&s);
    if (!error) error = compare(&s, &c);
    if (!error) error = keep(&c, &s.w, path);
    if (!error) error = walks(&s, &c, &how, argc < 2);
    for (k = 0; k < PREDICT_KINDS; k++) nearer &= c.mean[k][LEARN_ALL] < c.nothing[k];
    if (error) fprintf(stderr, "%s\n", error);
    else printf("what was learned is nearer than the mean: %s\n", nearer ? "yes" : "no");
    for (k = 0; k < PREDICT_KINDS; k++) {
        predictor_free(&c.plain[k]);
        for (i = 0; i < SEEDS; i++) predictor_free(&c.of[k][i]);
    }
    learn_free(&s);
    return error != NULL;
}
