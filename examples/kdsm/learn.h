/* learn.h - what the joints do to a garment, as a network learns it: for 03_learn.c, 04_after.c.
 * SPDX-License-Identifier: MIT
 *
 *     static lesson s;                                s.epochs, s.hidden, s.f, s.g, s.s set
 *     const char   *error = learn_prepare(&s);        all examples in both parameterisations
 *     learn_normalise(&s, s.in, s.inputs, 1, mean, over), and s.out[kind] likewise, each 0
 *     learn_train(&s, kind, seed, mean, over, &known, &w);      kind 0: hybrid, 1: body's surface
 *     learn_predict(&s, &w, kind, e, mean, over)      the garment [nv x 3] of example e
 *     learn_free(&s);
 */
#ifndef KDSM_EXAMPLE_LEARN_H
#define KDSM_EXAMPLE_LEARN_H

#include "chains.h"
#include "net.h"
#define LEARN_RATE  1e-3
#define LEARN_BATCH 8

typedef struct learn_anchor {   /* of a vertex of cloth: a face of the body, where on it */
    int    face;
    double w[3];
} learn_anchor;

typedef struct frame {      /* of an anchor in a pose: a point and three unit vectors   */
    double q[3], t[3], b[3], n[3];
} frame;

typedef struct lesson {
    figure      f;
    garment     g;
    data_set    s;
    kdsm_space *space;
    kdsm_pose  *pose;
    kdsm_cloth *cloth;
    learn_anchor *anchors;  /* [nv]                                                     */
    double     *body, *normal;      /* [f.nv x 3]                                       */
    double     *in;         /* [n x inputs]                                             */
    double     *out[2];     /* [n x 3 nv] of the hybrid, of the baseline                */
    double     *x;          /* [nv x 3]                                                 */
    int         inputs, outputs, seeds, epochs, hidden, on;
} lesson;

/* ----- the baseline: offsets from points of the body ---------------------------------- */

static inline void learn_normals(const figure *f, const double *x, double *n) {
    kdsmi_normals(f->nv, x, f->nf, f->faces, n);
}

/* The frame of anchor a: normal of the surface, tangent along the first edge of its face. */
static inline void learn_frame_at(const figure *f, const double *x, const double *normal,
                                  const learn_anchor *a, frame *out) {
    const int *v = f->faces + 3 * a->face;
    double     l, d;
    int        k, c;
    memset(out, 0, sizeof *out);
    for (k = 0; k < 3; k++)
        for (c = 0; c < 3; c++) {
            out->q[c] += a->w[k] * x[3 * v[k] + c];
            out->n[c] += a->w[k] * normal[3 * v[k] + c];
        }
    l = sqrt(kdsmi_dot(out->n, out->n));
    for (c = 0; c < 3; c++) {
        out->n[c] /= l > 0 ? l : 1;
        out->t[c] = x[3 * v[1] + c] - x[3 * v[0] + c];
    }
    d = kdsmi_dot(out->t, out->n);
    for (c = 0; c < 3; c++) out->t[c] -= d * out->n[c];
    l = sqrt(kdsmi_dot(out->t, out->t));
    for (c = 0; c < 3; c++) out->t[c] /= l > 0 ? l : 1;
    kdsmi_cross(out->n, out->t, out->b);
}

/* The nearest point of the body at rest for every vertex of the garment. */
static inline void learn_anchor_all(lesson *s) {
    int i, f;
    for (i = 0; i < s->s.nv; i++) {
        double best = HUGE_VAL, w[3];
        for (f = 0; f < s->f.nf; f++) {
            const int   *v = s->f.faces + 3 * f;
            const double d = kdsmi_triangle2(s->s.u + 3 * i, s->f.x + 3 * v[0], s->f.x + 3 * v[1],
                                             s->f.x + 3 * v[2], w);
            if (!(d < best)) continue;
            best = d, s->anchors[i].face = f;
            memcpy(s->anchors[i].w, w, sizeof w);
        }
    }
}

/* Offsets o [nv x 3] of x in the pose that s->body has, or x from o. */
static inline void learn_offsets(lesson *s, double *o, double *x, int back) {
    int i, c;
    for (i = 0; i < s->s.nv; i++) {
        frame  a;
        double e[3], *at = o + 3 * i, was[3];
        memcpy(was, at, sizeof was);        /* o may be x */
        learn_frame_at(&s->f, s->body, s->normal, s->anchors + i, &a);
        for (c = 0; c < 3 && back; c++)
            x[3 * i + c] = a.q[c] + was[0] * a.t[c] + was[1] * a.b[c] + was[2] * a.n[c];
        if (back) continue;
        kdsmi_sub(x + 3 * i, a.q, e);
        at[0] = kdsmi_dot(e, a.t), at[1] = kdsmi_dot(e, a.b), at[2] = kdsmi_dot(e, a.n);
    }
}

/* ----- inputs and outputs of all examples --------------------------------------------- */

/* R_0, then R_0' R_j. */
static inline void learn_inputs_of(const double *T, int njoints, double *in) {
    int j, r, c, k;
    for (j = 0; j < njoints; j++)
        for (r = 0; r < 3; r++)
            for (c = 0; c < 3; c++) {
                double sum = j ? 0 : T[4 * r + c];
                for (k = 0; k < 3 && j; k++) sum += T[4 * k + r] * T[12 * j + 4 * k + c];
                in[9 * j + 3 * r + c] = sum;
            }
}

static inline const char *learn_translate(lesson *s) {
    const size_t         no = (size_t)s->outputs;
    kdsm_displace_report r;
    double               error = 0, size = 0;
    int                  e, several = 0;
    for (e = 0; e < s->s.n; e++) {
        const double *T = s->s.T + (size_t)e * 12 * (size_t)s->s.njoints;
        double       *x = s->s.x + (size_t)e * no;
        learn_inputs_of(T, s->s.njoints, s->in + (size_t)e * (size_t)s->inputs);
        if (kdsm_pose_set(s->pose, T)) return "the space cannot be posed";
        if (kdsm_displace(s->cloth, s->pose, x, NULL, s->out[0] + (size_t)e * no, NULL, &r))
            return "no displacement";
        error += r.error_mean / s->s.n, size += r.d_mean / s->s.n, several += r.several;
        figure_skin(&s->f, T, s->body);
        learn_normals(&s->f, s->body, s->normal);
        learn_offsets(s, s->out[1] + (size_t)e * no, x, 0);
    }
    printf("%d examples of %d vertices, %d thrown out before; hybrid: mean |d| %.2f cm, mean error "
           "%.4f cm, %d vertices with several candidates\n", s->s.n, s->s.nv, s->s.thrown,
           100 * size, 100 * error, several);
    return s->s.n > 0 ? NULL : "there are no examples";
}

/* ----- learning ----------------------------------------------------------------------- */

static inline int learn_learns(const lesson *s, int e) { return data_split(s->s.id[e][0]) == 0; }

/* Rows a [n x m] less their mean over what is learned from, over one deviation (each: its own). */
static inline void learn_normalise(const lesson *s, double *a, int m, int each, double *mean,
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
        over[i] = sqrt(sum / count) + 1e-3;
    }
    for (i = 0; i < m && !each; i++) over[i] = sqrt(all) + 1e-9;
    for (e = 0; e < s->s.n; e++)
        for (i = 0; i < m; i++) {
            double *x = a + (size_t)e * (size_t)m + (size_t)i;
            *x = (*x - mean[i]) / over[i];
        }
}

/* What the network says of example e: s->x [nv x 3], or NULL. */
static inline const double *learn_predict(lesson *s, net *w, int kind, int e,
                                          const double *mean, const double *over) {
    const double *T = s->s.T + (size_t)e * 12 * (size_t)s->s.njoints;
    const double *said = net_forward(w, s->in + (size_t)e * (size_t)s->inputs);
    int           i;
    for (i = 0; i < s->outputs; i++) s->x[i] = mean[i] + over[i] * said[i];
    if (kind == 0 && kdsm_place(s->cloth, T, s->x, s->x, NULL)) return NULL;
    if (kind == 1) {
        figure_skin(&s->f, T, s->body);
        learn_normals(&s->f, s->body, s->normal);
        learn_offsets(s, s->x, s->x, 1);
    }
    return s->x;
}

/* The mean distance, m, of what the network says from what is true, over a split. */
static inline double learn_judge(lesson *s, net *w, int kind, int split, const double *mean,
                                 const double *over) {
    double error = 0;
    int    e, i, count = 0;
    for (e = 0; e < s->s.n; e++) {
        const double *x = s->s.x + (size_t)e * (size_t)s->outputs;
        if (data_split(s->s.id[e][0]) != split) continue;
        if (!learn_predict(s, w, kind, e, mean, over)) return HUGE_VAL;
        for (i = 0; i < s->s.nv; i++)
            error += sqrt(kdsmi_distance2(s->x + 3 * i, x + 3 * i)) / s->s.nv;
        count++;
    }
    return count ? error / count : 0;
}

/* Trains one network *out, to be freed; its error on the chains that test, *known: on those
 * learned from. */
static inline double learn_train(lesson *s, int kind, int seed, const double *mean,
                                 const double *over, double *known, net *out) {
    const int n[NET_LAYERS + 1] = {s->inputs, s->hidden, s->hidden, s->outputs};
    int      *order = (int *)malloc((size_t)s->s.n * sizeof(int)), i, e, count = 0, watch = 0;
    double   *best = NULL, least = HUGE_VAL, error = HUGE_VAL;
    uint64_t  draw = (uint64_t)seed + 77;
    net       w;
    memset(out, 0, sizeof *out);
    if (!order || !net_make(n, (uint64_t)seed, &w)) {
        free(order);
        return HUGE_VAL;
    }
    best = (double *)malloc(w.at[NET_LAYERS] * sizeof(double));
    for (e = 0; e < s->s.n; e++) {
        if (learn_learns(s, e)) order[count++] = e;
        watch |= data_split(s->s.id[e][0]) == 1;
    }
    for (e = 0; e < s->epochs && best; e++) {
        for (i = count - 1; i > 0; i--) {   /* a new order [Fisher, Yates] */
            const int k = (int)((net_random(&draw) + 1) / 2 * (i + 1)), swap = order[i];
            order[i] = order[k], order[k] = swap;
        }
        for (i = 0; i < count; i++) {
            const size_t at = (size_t)order[i];
            (void)net_backward(&w, s->in + at * (size_t)s->inputs,
                               s->out[kind] + at * (size_t)s->outputs);
            if (i % LEARN_BATCH == LEARN_BATCH - 1 || i == count - 1)
                net_adam(&w, (e < s->epochs / 2 ? 1 : 0.2) * LEARN_RATE, i % LEARN_BATCH + 1);
        }
        if (e % 10 != 9 && e != s->epochs - 1) continue;
        error = learn_judge(s, &w, kind, watch, mean, over);
        if (error < least) least = error, memcpy(best, w.p, w.at[NET_LAYERS] * sizeof(double));
    }
    if (best && least < HUGE_VAL) {
        memcpy(w.p, best, w.at[NET_LAYERS] * sizeof(double));
        error = learn_judge(s, &w, kind, 2, mean, over);
        *known = learn_judge(s, &w, kind, 0, mean, over);
    }
    free(best), free(order);
    *out = w;
    return error;
}

/* ----- all of it ---------------------------------------------------------------------- */

static inline const char *learn_prepare(lesson *s) {
    kdsm_desc desc = kdsm_desc_default();
    size_t    n = (size_t)s->s.n, nb = 3 * (size_t)s->f.nv;
    if (s->s.nv != s->g.nv || s->s.njoints != s->f.njoints)
        return "the examples are of another garment or body";
    figure_body(&s->f, &desc);
    desc.hooks.log.fn = cloth_log_stderr, desc.thickness = 0.1;
    if (kdsm_create(&desc, &s->space) || kdsm_pose_create(s->space, &s->pose)) return "no space";
    if (kdsm_cloth_create(s->space, s->s.nv, s->s.u, s->g.nf, s->g.faces, &s->cloth))
        return "the garment cannot be embedded";
    s->inputs = 9 * s->s.njoints, s->outputs = 3 * s->s.nv;
    s->anchors = (learn_anchor *)calloc((size_t)s->s.nv, sizeof *s->anchors);
    s->body = (double *)calloc(nb, 2 * sizeof(double));
    s->in = (double *)malloc(n * (size_t)s->inputs * sizeof(double));
    s->out[0] = (double *)malloc(n * (size_t)s->outputs * sizeof(double));
    s->out[1] = (double *)malloc(n * (size_t)s->outputs * sizeof(double));
    s->x = (double *)malloc((size_t)s->outputs * sizeof(double));
    if (!s->anchors || !s->body || !s->in || !s->out[0] || !s->out[1] || !s->x)
        return "out of memory";
    s->normal = s->body + nb;
    learn_anchor_all(s);
    return learn_translate(s);
}

/* Examples for those who bring none. */
static inline const char *learn_own_examples(const char *stem) {
    job         j = chains_job(stem);
    const char *error;
    j.edge = 0.05, j.chains = 10, j.poses = 1, j.steps = 20;
    chains_forget(&j);
    error = chains_dress(&j);
    if (!error) error = chains_make(&j);
    if (!error) error = chains_merge(&j);
    chains_free(&j);
    return error;
}

static inline void learn_free(lesson *s) {
    kdsm_cloth_destroy(s->cloth), kdsm_pose_destroy(s->pose), kdsm_destroy(s->space);
    garment_free(&s->g), figure_free(&s->f), data_free(&s->s);
    free(s->anchors), free(s->body), free(s->in), free(s->out[0]), free(s->out[1]), free(s->x);
}

#endif
