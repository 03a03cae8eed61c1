/* ccd.h - what the tests of continuous detection share: distances of moving pairs in long double
 * by other formulas than clothsim_collide.h uses, and the public queries with known answers. */
#ifndef CLOTH_CCD_H
#define CLOTH_CCD_H

#include "test.h"
#include "reference.h"

typedef struct ccd_query {
    int    ee, truth;                       /* truth: 1 touches                                 */
    double x[24], toi;                      /* positions at t = 0, then 1; NaN: not known       */
} ccd_query;

static inline int ccd_call(int ee, const double *x, double sep, double *toi) {
    return ee ? cloth_ccd_ee(x, x + 12, sep, toi) : cloth_ccd_vf(x, x + 12, sep, toi);
}

static inline ref_real ccd_dot(const ref_real *a, const ref_real *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* |p - a - s e|^2 for the best s in [0,1] */
static inline ref_real ccd_point_segment2(const ref_real *p, const ref_real *a,
                                          const ref_real *b) {
    ref_real e[3], d[3], s, ee;
    int      k;
    for (k = 0; k < 3; k++) e[k] = b[k] - a[k], d[k] = p[k] - a[k];
    ee = ccd_dot(e, e);
    s = ee > 0 ? ccd_dot(d, e) / ee : 0;
    s = s < 0 ? 0 : s > 1 ? 1 : s;
    for (k = 0; k < 3; k++) d[k] -= s * e[k];
    return ccd_dot(d, d);
}

/* |d - s e - t f|^2 with what of f is normal to e, g = f - (e.f/e.e) e: t = d.g/g.g. (By the normal
 * equations a point on a needle of angle 1e-5 was held for one beside it.) *inside: s and t are in
 * the triangle or square. */
static inline ref_real ccd_plane2(const ref_real *d, const ref_real *e, const ref_real *f,
                                  int ee, int *inside) {
    const ref_real a = ccd_dot(e, e), along = ccd_dot(e, f) / a;
    ref_real       g[3], r[3], s, t, gg;
    int            k;
    for (k = 0; k < 3; k++) g[k] = f[k] - along * e[k];
    gg = ccd_dot(g, g), t = ccd_dot(d, g) / gg;
    for (k = 0; k < 3; k++) r[k] = d[k] - t * f[k];
    s = ccd_dot(r, e) / a;
    *inside = gg > 1e-17L * ccd_dot(f, f) && s >= 0 && t >= 0 &&
              (ee ? s <= 1 && t <= 1 : s + t <= 1);
    for (k = 0; k < 3; k++) r[k] -= s * e[k];
    return ccd_dot(r, r);
}

static inline ref_real ccd_distance(int ee, const double *x, ref_real t) {
    ref_real p[4][3], d[3], e[3], f[3], best, inner;
    int      i, k, inside;
    for (i = 0; i < 4; i++)
        for (k = 0; k < 3; k++) {
            const ref_real a = (ref_real)x[3 * i + k] - (ref_real)x[k];
            const ref_real b = (ref_real)x[12 + 3 * i + k] - (ref_real)x[12 + k];
            p[i][k] = (1 - t) * a + t * b;
        }
    if (ee) {
        best = ccd_point_segment2(p[0], p[2], p[3]);
        best = fminl(best, ccd_point_segment2(p[1], p[2], p[3]));
        best = fminl(best, ccd_point_segment2(p[2], p[0], p[1]));
        best = fminl(best, ccd_point_segment2(p[3], p[0], p[1]));
        for (k = 0; k < 3; k++) {
            d[k] = p[2][k] - p[0][k];
            e[k] = p[1][k] - p[0][k];
            f[k] = p[2][k] - p[3][k];
        }
    } else {
        best = ccd_point_segment2(p[0], p[1], p[2]);
        best = fminl(best, ccd_point_segment2(p[0], p[2], p[3]));
        best = fminl(best, ccd_point_segment2(p[0], p[3], p[1]));
        for (k = 0; k < 3; k++) {
            d[k] = p[0][k] - p[1][k];
            e[k] = p[2][k] - p[1][k];
            f[k] = p[3][k] - p[1][k];
        }
    }
    inner = ccd_plane2(d, e, f, ee, &inside);
    return sqrtl(inside && inner < best ? inner : best);
}

/* Golden section on [a,b]. */
static inline ref_real ccd_golden(int ee, const double *x, ref_real a, ref_real b, ref_real *at) {
    const ref_real g = 0.61803398874989484820L;
    ref_real       p = b - g * (b - a), q = a + g * (b - a);
    ref_real       fp = ccd_distance(ee, x, p), fq = ccd_distance(ee, x, q);
    int            i;
    for (i = 0; i < 90; i++)
        if (fp < fq) {
            b = q, q = p, fq = fp;
            p = b - g * (b - a), fp = ccd_distance(ee, x, p);
        } else {
            a = p, p = q, fp = fq;
            q = a + g * (b - a), fq = ccd_distance(ee, x, q);
        }
    *at = fp < fq ? p : q;
    return fp < fq ? fp : fq;
}

/* Least distance over [0, end], by n samples and golden sections around the least of them. */
static inline ref_real ccd_least(int ee, const double *x, ref_real end, int n, ref_real *at) {
    ref_real best = HUGE_VALL, now, here;
    int      i, k = 0;
    *at = 0;
    for (i = 0; i <= n; i++) {
        now = ccd_distance(ee, x, end * i / n);
        if (now < best) best = now, k = i, *at = end * i / n;
    }
    now = ccd_golden(ee, x, end * (k > 0 ? k - 1 : 0) / n, end * (k < n ? k + 1 : n) / n, &here);
    if (now < best) best = now, *at = here;
    return best;
}

/* Largest difference of coordinates of a pair. */
static inline double ccd_size(const double *x) {
    double m = 0;
    int    i;
    for (i = 0; i < 24; i++) m = fmax(m, fabs(x[i] - x[i < 12 ? i % 3 : 12 + i % 3]));
    return m;
}

/* The shared queries, NULL when absent. Free them. */
static inline ccd_query *ccd_load(int *n) {
    FILE          *f = fopen(test_shared("data/ccd/queries.bin"), "rb");
    FILE          *g = fopen(test_shared("data/ccd/toi.bin"), "rb");
    const int      most = 1 << 17;
    ccd_query     *q = (ccd_query *)malloc((size_t)most * sizeof *q);
    unsigned char  record[194];
    *n = 0;
    while (q && f && g && *n < most && fread(record, sizeof record, 1, f) == 1) {
        ccd_query *one = q + (*n)++;
        one->ee = record[0];
        one->truth = record[1];
        memcpy(one->x, record + 2, sizeof one->x);
        if (fread(&one->toi, sizeof one->toi, 1, g) != 1) one->toi = NAN;
    }
    if (f) fclose(f);
    if (g) fclose(g);
    if (*n == 0) {
        free(q);
        q = NULL;
    }
    return q;
}

/* False alarms of queries that do not touch, by least distance over size: bin k holds 10^(k-19)
 * to 10^(k-18). */
typedef struct ccd_chart {
    int apart[20], alarm[20];
} ccd_chart;

static inline void ccd_chart_add(ccd_chart *c, const ccd_query *q, int alarm) {
    ref_real       at;
    const ref_real d = ccd_least(q->ee, q->x, 1, 200, &at) / (ref_real)ccd_size(q->x);
    int            k = d > 0 ? (int)floorl(log10l(d)) + 19 : 0;
    k = k < 0 ? 0 : k > 19 ? 19 : k;
    c->apart[k]++;
    c->alarm[k] += alarm;
}

static inline void ccd_chart_print(const ccd_chart *c) {
    int k;
    for (k = 0; k < 20; k++)
        if (c->apart[k])
            printf("    distance / size %s 1e%+03d: %5d free, %d called contact\n",
                   k ? "from" : "below", k ? k - 19 : -18, c->apart[k], c->alarm[k]);
}

#endif
