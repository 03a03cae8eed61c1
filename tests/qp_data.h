/* qp_data.h - reads the QP1 text files of the shared data, and checks an answer in long double from
 * the problem alone. Include after clothsim_collide.h, in one .c file per program. */
#ifndef CLOTH_TEST_QP_DATA_H
#define CLOTH_TEST_QP_DATA_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct qp_problem {
    char     name[128];
    int      infeasible;
    cloth_qp qp;
    double  *minv, *x0, *val, *h, *x, *lambda, *farkas;     /* x, lambda: the reference        */
    int     *row, *col;
} qp_problem;

static inline void *qp_get(size_t n, size_t size) {
    void *p = calloc(n ? n : 1, size);
    if (!p) {
        printf("out of memory\n");
        exit(1);
    }
    return p;
}

static inline void qp_make(qp_problem *p, int n, int m, int nz) {
    memset(p, 0, sizeof *p);
    p->minv = (double *)qp_get((size_t)n, sizeof(double));
    p->x0 = (double *)qp_get((size_t)n, sizeof(double));
    p->x = (double *)qp_get((size_t)n, sizeof(double));
    p->val = (double *)qp_get((size_t)nz, sizeof(double));
    p->h = (double *)qp_get((size_t)m, sizeof(double));
    p->lambda = (double *)qp_get((size_t)m, sizeof(double));
    p->farkas = (double *)qp_get((size_t)m, sizeof(double));
    p->row = (int *)qp_get((size_t)m + 1, sizeof(int));
    p->col = (int *)qp_get((size_t)nz, sizeof(int));
    p->qp.n = n, p->qp.m = m;
    p->qp.minv = p->minv, p->qp.x0 = p->x0, p->qp.val = p->val, p->qp.h = p->h;
    p->qp.row = p->row, p->qp.col = p->col;
}

static inline void qp_free(qp_problem *p) {
    free(p->minv);
    free(p->x0);
    free(p->x);
    free(p->val);
    free(p->h);
    free(p->lambda);
    free(p->farkas);
    free(p->row);
    free(p->col);
    memset(p, 0, sizeof *p);
}

static inline void qp_numbers(FILE *f, double *a, int n) {
    int i;
    for (i = 0; i < n; i++)
        if (fscanf(f, "%lf", a + i) != 1) a[i] = (double)NAN;
}

/* The next problem of the file; 0: no more. */
static inline int qp_read(FILE *f, qp_problem *p) {
    char word[256], name[128] = "", status[32];
    int  n, m, nz, i, k, e, at = 0, r = 0;
    memset(p, 0, sizeof *p);
    while (fscanf(f, "%255s", word) == 1) {
        if (!strcmp(word, "QP1")) {
            if (fscanf(f, "%127s", name) != 1) return 0;
        } else if (!strcmp(word, "tags") || !strcmp(word, "note")) {
            while ((k = fgetc(f)) != '\n' && k != EOF) {}
        } else if (!strcmp(word, "n")) {
            if (fscanf(f, "%d m %d nnz %d status %31s", &n, &m, &nz, status) != 4) return 0;
            qp_make(p, n, m, nz);
            memcpy(p->name, name, sizeof name);
            p->infeasible = !strcmp(status, "infeasible");
        } else if (!strcmp(word, "minv")) qp_numbers(f, p->minv, p->qp.n);
        else if (!strcmp(word, "x0")) qp_numbers(f, p->x0, p->qp.n);
        else if (!strcmp(word, "x")) qp_numbers(f, p->x, p->qp.n);
        else if (!strcmp(word, "lambda")) qp_numbers(f, p->lambda, p->qp.m);
        else if (!strcmp(word, "farkas")) qp_numbers(f, p->farkas, p->qp.m);
        else if (!strcmp(word, "row")) {
            if (fscanf(f, "%d %lf", &k, p->h + r) != 2) return 0;
            for (e = 0; e < k; e++, at++)
                if (fscanf(f, "%d %lf", p->col + at, p->val + at) != 2) return 0;
            p->row[++r] = at;
        } else if (!strcmp(word, "end")) {
            for (i = r + 1; i <= p->qp.m; i++) p->row[i] = at;
            return 1;
        }
    }
    return 0;
}

typedef struct qp_kkt {
    double primal, dual, complementarity, smallest;     /* relative; the smallest multiplier   */
    double objective;
    double worst;           /* of the first three                                              */
} qp_kkt;

/* Residuals in long double. With X the largest |x| or |x0|: primal: (g x - h)+ relative to
 * |h| + |g| X, the largest; dual: |x - x0 + minv G'lambda| to X; complementarity:
 * sum lambda |slack| to sum lambda (|h| + |g| X). */
static inline qp_kkt qp_check(const cloth_qp *q, const double *x, const double *lambda) {
    long double *u = (long double *)qp_get((size_t)q->n, sizeof *u), primal = 0, dual = 0;
    long double  big = 0, gap = 0, weight = 0, energy = 0;
    qp_kkt       r = {0, 0, 0, 0, 0, 0};
    int          i, p;
    for (i = 0; i < q->n; i++) big = fmaxl(big, fmaxl(fabsl((long double)x[i]),
                                                      fabsl((long double)q->x0[i])));
    for (i = 0; i < q->m; i++) {
        long double s = (long double)q->h[i], size = fabsl(s);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            s -= (long double)q->val[p] * (long double)x[q->col[p]];
            size += fabsl((long double)q->val[p]) * big;
            u[q->col[p]] += (long double)q->val[p] * (long double)lambda[i];
        }
        if (-s > primal * size) primal = -s / size;
        gap += (long double)lambda[i] * fabsl(s);
        weight += (long double)lambda[i] * size;
        if (!(lambda[i] >= r.smallest)) r.smallest = lambda[i];
    }
    for (i = 0; i < q->n; i++) {
        const long double d = (long double)x[i] - (long double)q->x0[i];
        const long double push = (long double)q->minv[i] * u[i];
        dual = fmaxl(dual, fabsl(d + push));
        if (q->minv[i] > 0) energy += 0.5L * d * d / (long double)q->minv[i];
    }
    r.primal = (double)primal;
    r.dual = (double)(big > 0 ? dual / big : dual);
    r.complementarity = (double)(weight > 0 ? gap / weight : 0);
    r.objective = (double)energy;
    r.worst = fmax(r.primal, fmax(r.dual, r.complementarity));
    free(u);
    return r;
}

/* Is y a Farkas certificate, by the letter of the contract? */
static inline int qp_is_farkas(const cloth_qp *q, const double *y) {
    long double *u = (long double *)qp_get((size_t)q->n, sizeof *u), sum = 0, size = 0, off = 0;
    double       big = 0, most = 0, least = 0;
    int          i, p;
    for (i = 0; i < q->m; i++) {
        most = fmax(most, y[i]);
        least = fmin(least, y[i]);
        sum += (long double)y[i] * (long double)q->h[i];
        size += fabsl((long double)y[i] * (long double)q->h[i]);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int         c = q->col[p];
            const long double t = (long double)y[i] * (long double)q->val[p];
            if (y[i] > 0) big = fmax(big, fabs(q->val[p]));
            if (q->minv[c] > 0) u[c] += t;
            else {
                sum -= t * (long double)q->x0[c];
                size += fabsl(t * (long double)q->x0[c]);
            }
        }
    }
    for (i = 0; i < q->n; i++) off = fmaxl(off, fabsl(u[i]));
    free(u);
    return most <= 1 && most >= 1 && least >= 0 && off <= 1e-10L * (long double)big &&
           sum < -1e-14L * size;
}

#endif
