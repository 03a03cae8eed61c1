/* learn.h - what the joints do to a garment, as a network learns it: for 03_learn.c, 04_after.c.
 * SPDX-License-Identifier: MIT
 *
 *     static lesson s;                                s.epochs, s.hidden, s.f, s.g, s.s set
 *     const char   *error = learn_prepare(&s);        all examples in all parameterisations
 *     error = learn_train(&s, kind, seed, &p);        a predictor, to be freed
 *     error = learn_judge(&s, &p, split, &marks);     how far it is from what is true
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
    int        inputs, outputs, seeds, epochs, hidden, few, on;
} lesson;

typedef struct marks {      /* of a predictor over a split                              */
    double error;           /* m, mean distance of the vertices                         */
    double volume;          /* mean |V - true V| / true V of the garment, openings closed */
    int    count;           /* examples                                                 */
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
    return s->s.T + (size_t)e * 12 * (size_t)s->s.njoints;
}

static inline const double *learn_x(const lesson *s, int e) {
    return s->s.x + (size_t)e * (size_t)s->outputs;
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
        predict_inputs(T, s->s.njoints, s->in + (size_t)e * (size_t)s->inputs);
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

/* The mean of rows a [n x m] over what is learned from, and the deviation, one for all: each its
 * own would make as much of a joint that hardly turns as of one that does. */
static inline void learn_spread(const lesson *s, const double *a, int m, double *mean,
                                double *over) {
    double all = 0, count = 0, sum;
    int    e, i;
    for (e = 0; e < s->s.n; e++) count += learn_learns(s, e);
    for (i = 0; i < m; i++) {
        for (mean[i] = 0, e = 0; e < s->s.n; e++)
            mean[i] += learn_learns(s, e) ? a[(size_t)e * (size_t)m + (size_t)i] / count : 0;
        for (sum = 0, e = 0; e < s->s.n; e++)
            sum += learn_learns(s, e) ? pow(a[(size_t)e * (size_t)m + (size_t)i] - mean[i], 2) : 0;
        all += sum / count / m;
    }
    for (i = 0; i < m; i++) over[i] = sqrt(all) + 1e-9;
}

/* Where the predictor puts the garment of example e: s->x, or NULL. */
static inline const double *learn_predict(lesson *s, predictor *p, int e) {
    return predict(&s->w, p, learn_T(s, e), s->x) ? NULL : s->x;
}

static inline const char *learn_judge(lesson *s, predictor *p, int split, marks *m) {
    int e;
    memset(m, 0, sizeof *m);
    for (e = 0; e < s->s.n; e++) {
        const double *x = p->kind == PREDICT_OWN
                          ? s->out[PREDICT_OWN] + (size_t)e * (size_t)s->outputs : learn_x(s, e);
        const double  volume = learn_volume(s, x);
        if (split ? data_split(s->s.id[e][0]) != split : !learn_learns(s, e)) continue;
        if (!learn_predict(s, p, e)) return "nothing is predicted";
        m->error += learn_distance(s->s.nv, s->x, x);
        m->volume += fabs(learn_volume(s, s->x) - volume) / fabs(volume);
        m->count++;
    }
    if (m->count) m->error /= m->count, m->volume /= m->count;
    return NULL;
}

/* Once through the examples of the list, in a new order. */
static inline void learn_epoch(lesson *s, predictor *p, int *list, int count, double rate,
                               double *one, uint64_t *draw) {
    const double decay = fmin(1, LEARN_DECAY / count);
    const size_t ni = (size_t)s->inputs, no = (size_t)s->outputs;
    double      *want = one + ni;
    size_t       k;
    int          i;
    for (i = count - 1; i > 0; i--) {       /* [Fisher, Yates] */
        const int j = (int)((net_random(draw) + 1) / 2 * (i + 1)), swap = list[i];
        list[i] = list[j], list[j] = swap;
    }
    for (i = 0; i < count; i++) {
        const double *in = s->in + (size_t)list[i] * ni, *out = s->out[p->kind]
                           + (size_t)list[i] * no;
        for (k = 0; k < ni; k++) one[k] = (in[k] - p->mean[0][k]) / p->over[0][k];
        for (k = 0; k < no; k++) want[k] = (out[k] - p->mean[1][k]) / p->over[1][k];
        (void)net_backward(&p->w, one, want);
        if (i % LEARN_BATCH == LEARN_BATCH - 1 || i == count - 1)
            net_adam(&p->w, rate, decay, i % LEARN_BATCH + 1);
    }
}

/* What no network can beat that does not look at the pose: the mean of what was learned from. */
static inline const char *learn_mean(lesson *s, int kind, predictor *p) {
    if (!predictor_make(&s->w, kind, 1, 1, p)) return "out of memory";
    memset(p->w.p, 0, p->w.at[NET_LAYERS] * sizeof(double));
    learn_spread(s, s->in, s->inputs, p->mean[0], p->over[0]);
    learn_spread(s, s->out[kind], s->outputs, p->mean[1], p->over[1]);
    return NULL;
}

/* A predictor *p, owned: of all epochs looked at, the best on the chains that watch. */
static inline const char *learn_train(lesson *s, int kind, int seed, predictor *p) {
    int        *list = (int *)malloc((size_t)s->s.n * sizeof(int)), e, count = 0, watch = 0;
    double     *best = NULL, *one, least = HUGE_VAL;
    uint64_t    draw = (uint64_t)seed + 77;
    const char *error = "out of memory";
    one = (double *)malloc((size_t)(s->inputs + s->outputs) * sizeof(double));
    if (!list || !one || !predictor_make(&s->w, kind, s->hidden, (uint64_t)seed, p)) goto done;
    learn_spread(s, s->in, s->inputs, p->mean[0], p->over[0]);
    learn_spread(s, s->out[kind], s->outputs, p->mean[1], p->over[1]);
    best = (double *)malloc(p->w.at[NET_LAYERS] * sizeof(double));
    for (e = 0; e < s->s.n; e++) {
        if (learn_learns(s, e)) list[count++] = e;
        watch |= data_split(s->s.id[e][0]) == 1;
    }
    error = best ? NULL : "out of memory";
    for (e = 0; e < s->epochs && !error; e++) {
        marks m;
        const double part = (double)e / s->epochs;
        learn_epoch(s, p, list, count, (part < 0.5 ? 1 : part < 0.75 ? 0.3 : 0.1) * LEARN_RATE, one,
                    &draw);
        if (e % 10 != 9 && e != s->epochs - 1) continue;
        error = learn_judge(s, p, watch, &m);
        if (error || m.error >= least) continue;
        least = m.error;
        memcpy(best, p->w.p, p->w.at[NET_LAYERS] * sizeof(double));
    }
    if (!error) memcpy(p->w.p, best, p->w.at[NET_LAYERS] * sizeof(double));
done:
    free(best), free(list), free(one);
    return error;
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
    s->inputs = 3 * s->s.njoints, s->outputs = 3 * s->s.nv;
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
