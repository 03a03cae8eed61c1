/* learn.h - what the joints do to a garment, as a network learns it: for 03_learn.c, 04_after.c.
 * SPDX-License-Identifier: MIT
 *
 *     static lesson s;                        s.epochs, s.hidden, s.modes, s.f, s.g, s.s set
 *     const char   *error = learn_prepare(&s);        all examples in all parameterisations
 *     error = learn_train(&s, kind, seed, &p);        a predictor, to be freed
 *     error = learn_judge(&s, &p, split, LEARN_ALL, &marks);     how far it is from what is true
 *     learn_free(&s);
 */
#ifndef KDSM_EXAMPLE_LEARN_H
#define KDSM_EXAMPLE_LEARN_H

#include "chains.h"
#include "predict.h"
#define LEARN_RATE  3e-3
#define LEARN_BATCH 8
#define LEARN_DECAY 60.0    /* over the examples, at most 1: of the parameters, times the rate, a
                             * step; measured best 1 for 104 examples, 0.3 for 160 and 320 */

typedef struct lesson {
    figure     f;
    garment    g;
    data_set   s;
    wearer     w;
    double    *in;          /* [n x inputs]                                             */
    double    *out[PREDICT_KINDS + 1];  /* [n x 3 nv]; the last: a program's own        */
    double     lost[PREDICT_KINDS]; /* m, mean: what a parameterisation does not give back */
    double    *x;           /* [nv x 3]                                                 */
    int      (*rim)[3];     /* [nrim] an edge with one face, turned to close it; its loop */
    int        nrim, nloops;
    int        inputs, outputs, seeds, epochs, hidden, modes, few, on;
} lesson;

enum { LEARN_ALL, LEARN_STILL, LEARN_MOVING, LEARN_SORTS };     /* of examples */

typedef struct marks {      /* of a predictor over a split, by sort of the examples     */
    double error[LEARN_SORTS];      /* m, mean distance of the vertices                 */
    double volume[LEARN_SORTS];     /* mean |V - true V| / true V, openings closed      */
    int    count[LEARN_SORTS];      /* examples                                         */
} marks;

/* ----- the volume of a garment with its openings closed -------------------------------- */

static inline int learn_by_ends(const void *a, const void *b) {
    const int *p = (const int *)a, *q = (const int *)b;
    return p[0] != q[0] ? (p[0] < q[0] ? -1 : 1) : (p[1] > q[1]) - (p[1] < q[1]);
}

/* The edges with one face, and which of them hang together. */
static inline int learn_rims(lesson *s) {
    const int n = 3 * s->g.nf;
    int     (*e)[3] = (int(*)[3])malloc((size_t)n * sizeof *e), i, k, changed = 1;
    s->rim = (int(*)[3])malloc((size_t)n * sizeof *s->rim);
    for (i = 0; e && i < n; i++) {
        const int a = s->g.faces[i], b = s->g.faces[i % 3 == 2 ? i - 2 : i + 1];
        e[i][0] = a < b ? a : b, e[i][1] = a < b ? b : a, e[i][2] = a < b;
    }
    if (e && s->rim) qsort(e, (size_t)n, sizeof *e, learn_by_ends);
    for (i = 0; e && s->rim && i < n; i += k) {
        for (k = 1; i + k < n && learn_by_ends(e + i, e + i + k) == 0; k++) continue;
        if (k > 1) continue;
        s->rim[s->nrim][0] = e[i][e[i][2]], s->rim[s->nrim][1] = e[i][!e[i][2]];
        s->rim[s->nrim][2] = s->nrim, s->nrim++;
    }
    while (changed)                         /* the smallest number of the loop goes round it */
        for (changed = i = 0; i < s->nrim; i++)
            for (k = 0; k < s->nrim; k++)
                if (s->rim[i][1] == s->rim[k][0] && s->rim[i][2] != s->rim[k][2]) {
                    const int least = s->rim[i][2] < s->rim[k][2] ? s->rim[i][2] : s->rim[k][2];
                    s->rim[i][2] = s->rim[k][2] = least, changed = 1;
                }
    free(e);
    return e && s->rim;
}

/* m^3, signed: the faces, and each opening closed by a fan round the mean of its edges. */
static inline double learn_volume(const lesson *s, const double *x) {
    double sum = 0, n[3];
    int    i, k, c, l;
    for (i = 0; i < s->g.nf; i++) {
        const int *v = s->g.faces + 3 * i;
        kdsmi_cross(x + 3 * v[1], x + 3 * v[2], n);
        sum += kdsmi_dot(x + 3 * v[0], n) / 6;
    }
    for (l = 0; l < s->nrim; l++) {
        double middle[3] = {0, 0, 0};
        int    count = 0;
        if (s->rim[l][2] != l) continue;
        for (i = 0; i < s->nrim; i++) {
            if (s->rim[i][2] != l) continue;
            for (count++, k = 0; k < 2; k++)
                for (c = 0; c < 3; c++) middle[c] += 0.5 * x[3 * s->rim[i][k] + c];
        }
        for (c = 0; c < 3; c++) middle[c] /= count;
        for (i = 0; i < s->nrim; i++) {
            if (s->rim[i][2] != l) continue;
            kdsmi_cross(x + 3 * s->rim[i][0], x + 3 * s->rim[i][1], n);
            sum += kdsmi_dot(middle, n) / 6;
        }
    }
    return sum;
}

static inline double learn_distance(int nv, const double *a, const double *b) {
    double sum = 0;
    int    i;
    for (i = 0; i < nv; i++) sum += sqrt(kdsmi_distance2(a + 3 * i, b + 3 * i)) / nv;
    return sum;
}

/* ----- inputs and outputs of all examples --------------------------------------------- */

static inline const double *learn_T(const lesson *s, int e) {
    return s->s.T + (size_t)e * 24 * (size_t)s->s.njoints;
}

static inline const double *learn_before(const lesson *s, int e) {
    return learn_T(s, e) + 12 * (size_t)s->s.njoints;
}

static inline const double *learn_x(const lesson *s, int e) {
    return s->s.x + (size_t)e * (size_t)s->outputs;
}

/* Joints that are where they were: a pose that has settled. */
static inline int learn_sort(const lesson *s, int e) {
    return memcmp(learn_T(s, e), learn_before(s, e), 12 * (size_t)s->s.njoints * sizeof(double))
           ? LEARN_MOVING : LEARN_STILL;
}

/* Of the chains that are to be learned from those below `few`, where it is given. */
static inline int learn_learns(const lesson *s, int e) {
    return data_split(s->s.id[e][0]) == 0 && (s->few < 1 || s->s.id[e][0] < s->few);
}

static inline const char *learn_translate(lesson *s) {
    const size_t         no = (size_t)s->outputs;
    kdsm_displace_report r;
    const char          *error = NULL;
    double               size = 0;
    int                  e, k, several = 0;
    for (e = 0; e < s->s.n; e++) {
        const double *T = learn_T(s, e);
        predict_inputs(T, learn_before(s, e), s->s.njoints, s->in + (size_t)e * (size_t)s->inputs);
        for (k = 0; k < PREDICT_KINDS && !error; k++) {
            double *out = s->out[k] + (size_t)e * no;
            error = wearer_take(&s->w, k, T, learn_x(s, e), out, &r);
            if (k == PREDICT_SPACE) size += r.d_mean / s->s.n, several += r.several;
            memcpy(s->x, out, no * sizeof(double));
            if (!error) error = wearer_put(&s->w, k, T, s->x);
            s->lost[k] += learn_distance(s->s.nv, s->x, learn_x(s, e)) / s->s.n;
        }
        if (error) return error;
    }
    printf("%d examples of %d vertices, %d thrown out before; hybrid: mean |d| %.2f cm, %d "
           "vertices with several candidates\n", s->s.n, s->s.nv, s->s.thrown, 100 * size, several);
    for (k = e = 0; e < s->s.n; e++) k += learn_learns(s, e);
    return k > 0 ? NULL : "there are no examples to learn from";
}

/* ----- learning ----------------------------------------------------------------------- */

/* The mean of columns from .. to - 1 of rows a [n x m] over what is learned from, and the
 * deviation, one for all: each its own would make as much of a joint that hardly turns as of one
 * that does. */
static inline void learn_spread(const lesson *s, const double *a, int from, int to, int m,
                                double *mean, double *over) {
    double all = 0, count = 0, sum;
    int    e, i;
    for (e = 0; e < s->s.n; e++) count += learn_learns(s, e);
    for (i = from; i < to; i++) {
        for (mean[i] = 0, e = 0; e < s->s.n; e++)
            mean[i] += learn_learns(s, e) ? a[(size_t)e * (size_t)m + (size_t)i] / count : 0;
        for (sum = 0, e = 0; e < s->s.n; e++)
            sum += learn_learns(s, e) ? pow(a[(size_t)e * (size_t)m + (size_t)i] - mean[i], 2) : 0;
        all += sum / count / (to - from);
    }
    for (i = from; i < to; i++) over[i] = sqrt(all) + 1e-9;
}

/* Where the predictor puts the garment of example e: s->x, or NULL. */
static inline const double *learn_predict(lesson *s, predictor *p, int e) {
    return predict(&s->w, p, learn_T(s, e), learn_before(s, e), s->x) ? NULL : s->x;
}

/* Over the examples of a split; of one sort, or all. */
static inline const char *learn_judge(lesson *s, predictor *p, int split, int sort, marks *m) {
    int e, k;
    memset(m, 0, sizeof *m);
    for (e = 0; e < s->s.n; e++) {
        const double *x = p->kind == PREDICT_OWN
                          ? s->out[PREDICT_OWN] + (size_t)e * (size_t)s->outputs : learn_x(s, e);
        const double  volume = learn_volume(s, x);
        double        error, off;
        if (split ? data_split(s->s.id[e][0]) != split : !learn_learns(s, e)) continue;
        if (sort != LEARN_ALL && learn_sort(s, e) != sort) continue;
        if (!learn_predict(s, p, e)) return "nothing is predicted";
        error = learn_distance(s->s.nv, s->x, x);
        off = fabs(learn_volume(s, s->x) - volume) / fabs(volume);
        for (k = 0; k < LEARN_SORTS; k++) {
            if (k != LEARN_ALL && k != learn_sort(s, e)) continue;
            m->error[k] += error, m->volume[k] += off, m->count[k]++;
        }
    }
    for (k = 0; k < LEARN_SORTS; k++)
        if (m->count[k]) m->error[k] /= m->count[k], m->volume[k] /= m->count[k];
    return NULL;
}

/* One network's training: rows of the examples of its sort that are learned from, inputs
 * [n x inputs] and outputs [n x modes], each over its spread, and the factor of what is said; the
 * modes [modes x outputs] that the network says, a small one of its own. */
typedef struct training {
    int     n, modes;
    int    *order;
    double *in, *gain, *out, *mode;
    net     w;
} training;

static inline void training_free(training *t) {
    net_free(&t->w);
    free(t->order), free(t->in), free(t->mode);
}

/* Rows a [n x m] made orthonormal, the first first; what is left of none is 0.  [Gram, Schmidt] */
static inline void learn_orthonormal(double *a, int n, int m) {
    int i, j, k, twice;
    for (i = 0; i < n; i++) {
        double *r = a + (size_t)i * (size_t)m, was = 0, l = 0;
        for (k = 0; k < m; k++) was += r[k] * r[k];
        for (twice = 0; twice < 2; twice++)
            for (j = 0; j < i; j++) {
                const double *q = a + (size_t)j * (size_t)m;
                double        dot = 0;
                for (k = 0; k < m; k++) dot += q[k] * r[k];
                for (k = 0; k < m; k++) r[k] -= dot * q[k];
            }
        for (k = 0; k < m; k++) l += r[k] * r[k];
        for (k = 0; k < m; k++) r[k] = l > 1e-24 * was && l > 0 ? r[k] / sqrt(l) : 0;
    }
}

/* The outputs' largest modes, of all examples that are learned from, by iteration of a subspace;
 * then the outputs in them, scaled to a mean square of 1. full [n x outputs]: what they are of. */
static inline void learn_modes(training *t, const double *full, int outputs) {
    const size_t no = (size_t)outputs, nm = (size_t)t->modes;
    const double scale = sqrt((double)t->modes / outputs);
    uint64_t     draw = 5;
    size_t       e, m, k;
    int          round;
    for (k = 0; k < nm * no; k++) t->mode[k] = net_random(&draw);
    for (round = 0; round < 6; round++) {
        learn_orthonormal(t->mode, t->modes, outputs);
        for (e = 0; e < (size_t)t->n; e++)
            for (m = 0; m < nm; m++) {
                const double *q = t->mode + m * no, *y = full + e * no;
                double        dot = 0;
                for (k = 0; k < no; k++) dot += q[k] * y[k];
                t->out[e * nm + m] = dot;
            }
        if (round == 5) break;
        memset(t->mode, 0, nm * no * sizeof(double));
        for (e = 0; e < (size_t)t->n; e++)
            for (m = 0; m < nm; m++)
                for (k = 0; k < no; k++)
                    t->mode[m * no + k] += t->out[e * nm + m] * full[e * no + k];
    }
    for (k = 0; k < (size_t)t->n * nm; k++) t->out[k] *= scale;
    for (k = 0; k < nm * no; k++) t->mode[k] /= scale;
}

static inline int training_wants(const lesson *s, int sort, int e) {
    return learn_learns(s, e) && learn_sort(s, e) == sort;
}

/* Rows, and what the network is to say: the outputs; of what moves, what the other leaves. */
static inline void training_rows(const lesson *s, predictor *p, int sort, training *t,
                                 double *full) {
    const size_t ni = (size_t)t->w.n[0], no = (size_t)s->outputs;
    double      *in = p->swing.e[0];
    size_t       k;
    int          e, i = 0;
    for (e = 0; e < s->s.n; e++) {
        const double *out = s->out[p->kind] + (size_t)e * no;
        if (!training_wants(s, sort, e)) continue;
        memcpy(in, s->in + (size_t)e * (size_t)s->inputs, (size_t)s->inputs * sizeof(double));
        t->gain[i] = predictor_scale(p, in);
        if (sort == LEARN_STILL) t->gain[i] = 1;
        memcpy(t->in + (size_t)i * ni, in, ni * sizeof(double));
        predictor_say(p, 0, in, full + (size_t)i * no);     /* 0 of the untaught */
        for (k = 0; k < no; k++)
            full[(size_t)i * no + k] = (out[k] - full[(size_t)i * no + k]) / p->over[1][k];
        t->order[i] = i, i++;
    }
}

/* Room and rows; p's spreads are set, and t->n. NULL or what is wrong. */
static inline const char *training_make(const lesson *s, predictor *p, int sort, uint64_t seed,
                                        training *t) {
    const size_t no = (size_t)s->outputs;
    double      *full;
    int          n[NET_LAYERS + 1];
    t->modes = s->modes < t->n ? s->modes : t->n;
    t->modes = t->modes < s->outputs ? t->modes : s->outputs;
    n[0] = sort == LEARN_STILL ? p->still.n[0] : p->swing.n[0];
    n[1] = n[2] = s->hidden, n[3] = t->modes;
    t->order = (int *)malloc((size_t)t->n * sizeof(int));
    t->in = (double *)malloc((size_t)t->n * (size_t)(n[0] + 1 + n[3]) * sizeof(double));
    t->mode = (double *)malloc((size_t)t->modes * no * sizeof(double));
    full = (double *)malloc((size_t)t->n * no * sizeof(double));
    if (!t->order || !t->in || !t->mode || !full || !net_make(n, seed, &t->w)) {
        free(full);
        return "out of memory";
    }
    t->gain = t->in + (size_t)t->n * (size_t)n[0], t->out = t->gain + t->n;
    training_rows(s, p, sort, t, full);
    learn_modes(t, full, s->outputs);
    free(full);
    return NULL;
}

/* Once through the examples, in a new order. */
static inline void training_epoch(training *t, double rate, uint64_t *draw) {
    const double decay = fmin(1, LEARN_DECAY / t->n);
    int          i;
    for (i = t->n - 1; i > 0; i--) {        /* [Fisher, Yates] */
        const int j = (int)((net_random(draw) + 1) / 2 * (i + 1)), swap = t->order[i];
        t->order[i] = t->order[j], t->order[j] = swap;
    }
    for (i = 0; i < t->n; i++) {
        const size_t e = (size_t)t->order[i];
        (void)net_backward(&t->w, t->in + e * (size_t)t->w.n[0], t->out + e * (size_t)t->modes,
                           t->gain[e]);
        if (i % LEARN_BATCH == LEARN_BATCH - 1 || i == t->n - 1)
            net_adam(&t->w, rate, decay, i % LEARN_BATCH + 1);
    }
}

/* The network as it is now into one of the predictor's, which says the outputs themselves: its last
 * layer is the small one's times the modes. */
static inline void training_give(const training *t, net *to) {
    const int    rows = t->w.n[NET_LAYERS - 1] + 1, no = to->n[NET_LAYERS];
    const size_t at = t->w.at[NET_LAYERS - 1];
    int          i, m, k;
    memcpy(to->p, t->w.p, at * sizeof(double));
    for (i = 0; i < rows; i++) {            /* the last row is the bias */
        const double *from = t->w.p + at + (size_t)i * (size_t)t->modes;
        double       *row = to->p + at + (size_t)i * (size_t)no;
        memset(row, 0, (size_t)no * sizeof(double));
        for (m = 0; m < t->modes; m++)
            for (k = 0; k < no; k++)
                row[k] += from[m] * t->mode[(size_t)m * (size_t)no + (size_t)k];
    }
}

/* What no network can beat that does not look at the pose: the mean of what was learned from. */
static inline const char *learn_mean(lesson *s, int kind, int hidden, predictor *p) {
    const int turns = s->inputs / 2;
    if (!predictor_make(&s->w, kind, hidden, 1, p)) return "out of memory";
    memset(p->still.p, 0, p->still.at[NET_LAYERS] * sizeof(double));
    memset(p->swing.p, 0, p->swing.at[NET_LAYERS] * sizeof(double));
    learn_spread(s, s->in, 0, turns, s->inputs, p->mean[0], p->over[0]);
    learn_spread(s, s->in, turns, s->inputs, s->inputs, p->mean[0], p->over[0]);
    memset(p->mean[0] + turns, 0, (size_t)turns * sizeof(double));
    learn_spread(s, s->out[kind], 0, s->outputs, s->outputs, p->mean[1], p->over[1]);
    return NULL;
}

/* One network of the predictor's, `to`: of all epochs looked at, the best on the chains that watch.
 * Without examples of the sort it stays as it is. */
static inline const char *learn_network(lesson *s, int sort, int seed, predictor *p, net *to) {
    const size_t np = to->at[NET_LAYERS];
    double      *best = (double *)malloc(np * sizeof(double)), least = HUGE_VAL;
    uint64_t     draw = (uint64_t)seed + 77;
    const char  *error = best ? NULL : "out of memory";
    int          e, watch = 0;
    training     t;
    memset(&t, 0, sizeof t);
    for (e = 0; e < s->s.n; e++) {
        t.n += training_wants(s, sort, e);
        watch |= data_split(s->s.id[e][0]) == 1 && learn_sort(s, e) == sort;
    }
    if (!error && t.n > 0) error = training_make(s, p, sort, (uint64_t)seed, &t);
    for (e = 0; e < s->epochs && !error && t.n > 0; e++) {
        marks        m;
        const double part = (double)e / s->epochs;
        training_epoch(&t, (part < 0.5 ? 1 : part < 0.75 ? 0.3 : 0.1) * LEARN_RATE, &draw);
        if (e % 10 != 9 && e != s->epochs - 1) continue;
        training_give(&t, to);
        error = learn_judge(s, p, watch, sort, &m);
        if (error || m.error[sort] >= least) continue;
        least = m.error[sort];
        memcpy(best, to->p, np * sizeof(double));
    }
    if (!error && t.n > 0) memcpy(to->p, best, np * sizeof(double));
    free(best), training_free(&t);
    return error;
}

/* A predictor *p, owned: what hangs first, then what swings. */
static inline const char *learn_train(lesson *s, int kind, int seed, predictor *p) {
    const char *error = learn_mean(s, kind, s->hidden, p);
    if (!error) error = learn_network(s, LEARN_STILL, seed, p, &p->still);
    return error ? error : learn_network(s, LEARN_MOVING, seed, p, &p->swing);
}

/* ----- all of it ---------------------------------------------------------------------- */

static inline const char *learn_prepare(lesson *s) {
    const size_t n = (size_t)s->s.n;
    const char  *error;
    int          k;
    if (s->s.nv != s->g.nv || s->s.njoints != s->f.njoints)
        return "the examples are of another garment or body";
    error = wearer_make(&s->f, s->s.nv, s->s.u, s->g.nf, s->g.faces, &s->w);
    if (error) return error;
    s->inputs = 6 * s->s.njoints, s->outputs = 3 * s->s.nv;
    s->in = (double *)malloc(n * (size_t)s->inputs * sizeof(double));
    s->x = (double *)malloc((size_t)s->outputs * sizeof(double));
    if (!s->in || !s->x || !learn_rims(s)) return "out of memory";
    for (k = 0; k <= PREDICT_KINDS; k++) {
        s->out[k] = (double *)malloc(n * (size_t)s->outputs * sizeof(double));
        if (!s->out[k]) return "out of memory";
    }
    return learn_translate(s);
}

/* Examples for those who bring none. */
static inline const char *learn_own_examples(const char *stem) {
    job         j = chains_job(stem);
    const char *error;
    j.edge = 0.05, j.chains = 20, j.poses = 1, j.steps = 20, j.around = 0.2;
    chains_forget(&j);
    error = chains_dress(&j);
    if (!error) error = chains_make(&j);
    if (!error) error = chains_merge(&j);
    chains_free(&j);
    return error;
}

static inline void learn_free(lesson *s) {
    int k;
    wearer_free(&s->w);
    garment_free(&s->g), figure_free(&s->f), data_free(&s->s);
    for (k = 0; k <= PREDICT_KINDS; k++) free(s->out[k]);
    free(s->in), free(s->x), free(s->rim);
}

#endif
