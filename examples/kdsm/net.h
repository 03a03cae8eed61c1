/* net.h - a small network in plain C: two hidden layers, Adam, the L2 loss.
 * SPDX-License-Identifier: MIT
 *
 *     a_0 = input,  a_l+1 = tanh(a_l W_l + b_l),  the last without tanh            W [n_l x n_l+1]
 *     loss = sum_o (gain a_o - t_o)^2 / (2 outputs)
 *     Adam  [Kingma, Ba 2015, algorithm 1]: m, v running means of g and g^2, each over what is left
 *           of their start at 0; p -= rate (m / (sqrt v + 1e-8) + decay p)
 *           [Loshchilov, Hutter 2019]
 *
 * W is kept by input, so that the inner loops run along the outputs and become vector code.
 * Deterministic: the seed and the order of the calls say everything.
 * checked: tests/test_kdsm.c: network_by_central_differences, network_learns
 */
#ifndef KDSM_EXAMPLE_NET_H
#define KDSM_EXAMPLE_NET_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define NET_LAYERS 3

typedef struct net {
    int     n[NET_LAYERS + 1];      /* inputs, hidden, hidden, outputs                  */
    size_t  at[NET_LAYERS + 1];     /* where a layer's W begins in p; b follows         */
    double *p, *g, *m, *v;          /* parameters, gradient, Adam's means               */
    double *a[NET_LAYERS + 1];      /* activations                                      */
    double *e[NET_LAYERS + 1];      /* dloss/da                                         */
    int     step;
} net;

static inline void net_free(net *w) {
    free(w->p), free(w->a[0]);
    memset(w, 0, sizeof *w);
}

static inline double net_random(uint64_t *s) {
    *s = *s * 6364136223846793005u + 1442695040888963407u;
    return (double)(*s >> 11) / 4503599627370496.0 - 1;
}

/* 1, or 0 without memory. */
static inline int net_make(const int n[NET_LAYERS + 1], uint64_t seed, net *w) {
    size_t total = 0, units = 0, i;
    int    l;
    memset(w, 0, sizeof *w);
    memcpy(w->n, n, sizeof w->n);
    for (l = 0; l <= NET_LAYERS; l++) units += (size_t)n[l];
    for (l = 0; l < NET_LAYERS; l++)
        w->at[l] = total, total += ((size_t)n[l] + 1) * (size_t)n[l + 1];
    w->at[NET_LAYERS] = total;
    w->p = (double *)calloc(total, 4 * sizeof(double));
    w->a[0] = (double *)calloc(units, 2 * sizeof(double));
    if (!w->p || !w->a[0]) {
        net_free(w);
        return 0;
    }
    w->g = w->p + total, w->m = w->g + total, w->v = w->m + total;
    for (l = 0; l < NET_LAYERS; l++) w->a[l + 1] = w->a[l] + n[l];
    for (l = 0; l <= NET_LAYERS; l++) w->e[l] = w->a[l] + units;
    seed = seed * 0x9e3779b97f4a7c15u + 1;
    for (l = 0; l < NET_LAYERS; l++)        /* the variance of each layer's sums stays */
        for (i = 0; i < (size_t)n[l] * (size_t)n[l + 1]; i++)
            w->p[w->at[l] + i] = net_random(&seed) * sqrt(3.0 / n[l])
                                 * (l == NET_LAYERS - 1 ? 0.1 : 1);
    return 1;
}

/* The outputs for an input: w->a[NET_LAYERS]. */
static inline const double *net_forward(net *w, const double *in) {
    int l, i, o;
    memcpy(w->a[0], in, (size_t)w->n[0] * sizeof *in);
    for (l = 0; l < NET_LAYERS; l++) {
        const int     n = w->n[l + 1];
        const double *W = w->p + w->at[l];
        double       *a = w->a[l + 1];
        memcpy(a, W + (size_t)w->n[l] * (size_t)n, (size_t)n * sizeof *a);
        for (i = 0; i < w->n[l]; i++) {
            const double x = w->a[l][i], *row = W + (size_t)i * (size_t)n;
            for (o = 0; o < n; o++) a[o] += x * row[o];
        }
        for (o = 0; o < n && l < NET_LAYERS - 1; o++) a[o] = tanh(a[o]);
    }
    return w->a[NET_LAYERS];
}

/* The loss of an example; its gradient is added to w->g. */
static inline double net_backward(net *w, const double *in, const double *target, double gain) {
    const int outputs = w->n[NET_LAYERS];
    double    loss = 0;
    int       l, i, o;
    (void)net_forward(w, in);
    for (o = 0; o < outputs; o++) {
        const double d = gain * w->a[NET_LAYERS][o] - target[o];
        loss += 0.5 * d * d / outputs;
        w->e[NET_LAYERS][o] = gain * d / outputs;
    }
    for (l = NET_LAYERS - 1; l >= 0; l--) {
        const int     n = w->n[l + 1];
        const double *W = w->p + w->at[l], *e = w->e[l + 1];
        double       *G = w->g + w->at[l];
        for (o = 0; o < n; o++) G[(size_t)w->n[l] * (size_t)n + (size_t)o] += e[o];
        for (i = 0; i < w->n[l]; i++) {
            const double *row = W + (size_t)i * (size_t)n, x = w->a[l][i];
            double       *g = G + (size_t)i * (size_t)n, s[4] = {0, 0, 0, 0};
            for (o = 0; o < n; o++) g[o] += x * e[o];
            if (l == 0) continue;
            for (o = 0; o + 3 < n; o += 4)
                s[0] += row[o] * e[o], s[1] += row[o + 1] * e[o + 1],
                s[2] += row[o + 2] * e[o + 2], s[3] += row[o + 3] * e[o + 3];
            for (; o < n; o++) s[0] += row[o] * e[o];
            w->e[l][i] = (1 - x * x) * (s[0] + s[1] + s[2] + s[3]);     /* tanh' */
        }
    }
    return loss;
}

/* A step of Adam with the gradient of `count` examples, which is cleared. */
static inline void net_adam(net *w, double rate, double decay, int count) {
    const size_t n = w->at[NET_LAYERS];
    const double c1 = 1 - pow(0.9, ++w->step), c2 = 1 - pow(0.999, w->step), by = 1.0 / count;
    size_t       i;
    for (i = 0; i < n; i++) {
        const double g = w->g[i] * by;
        w->m[i] = 0.9 * w->m[i] + 0.1 * g;
        w->v[i] = 0.999 * w->v[i] + 0.001 * g * g;
        w->p[i] -= rate * (w->m[i] / c1 / (sqrt(w->v[i] / c2) + 1e-8) + decay * w->p[i]);
        w->g[i] = 0;
    }
}

#endif
