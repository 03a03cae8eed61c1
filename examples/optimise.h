/* optimise.h - finds the least value of a smooth function of many numbers: L-BFGS and Adam.
 * SPDX-License-Identifier: MIT
 *
 * Helper of the examples; libc and libm alone.
 *
 *     static double f(const double *p, double *g, void *user) {       g = df/dp, returns f
 *         ... a run; HUGE_VAL where it fails ...
 *     }
 *     optimise_options o = optimise_default();
 *     o.first = 0.3;                                  p moves by 0.3 at most at the first step
 *     optimise_result r = optimise_lbfgs(n, p, f, user, &o);
 *
 * Scale the unknowns so that 1 is a large change of each: log of a stiffness, metres over the size
 * of the scene. Both methods forget units, and L-BFGS needs half as many runs then.
 *
 * WHICH ONE. L-BFGS wherever f is the same each time it is asked. It compares values, so a loss
 * that jumps (frames that fail and return, nearest points found anew) holds it up: Adam never looks
 * at values, needs ten times the runs, and gets through.
 *
 * ---- L-BFGS [Nocedal 1980] ----
 * With s = p' - p, y = g' - g of the last `memory` steps the inverse Hessian B is known along them:
 * B y = s. The direction d = -B g comes of two loops, newest to oldest and back:
 *
 *     q = g;   a_i = s_i'q / y_i's_i,  q -= a_i y_i;   q *= s'y / y'y  (of the newest);
 *     b = y_i'q / y_i's_i,  q += (a_i - b) s_i;        d = -q
 *
 * LINE SEARCH [Lewis, Overton 2013]: the step t along d shall lower f by 1e-4 of what the slope
 * promises and leave less than 0.9 of the slope. lo: too short so far, hi: too long so far.
 *
 *     t too long   (f(p + t d) > f + 1e-4 t d'g, or the run FAILED)   hi = t
 *     t too short  (d'g(p + t d) < 0.9 d'g)                           lo = t
 *     t = hi unknown ? 2 t : (lo + hi)/2
 *
 * No interpolation: a failed run has no value to interpolate. A step that lowers f is kept though
 * it is still short when the runs of one search are used up, or when t d'g promises less than is
 * asked for (the values of runs that stop at a tolerance are noise there); without one B is
 * forgotten, then it is the end.
 *
 * ---- Adam [Kingma, Ba 2015] ----
 *     m += 0.1 (g - m),  v += 0.001 (g g - v),  p -= rate m^ / (sqrt v^ + 1e-12)
 *
 * m^ and v^ are m and v over 1 - 0.9^k and 1 - 0.999^k; rate falls as a half cosine from o.first to
 * 0. A failed run halves what is left of the rate and goes back to the best p.
 * checked: tests/test_optimise.c
 */
#ifndef CLOTHSIM_EXAMPLE_OPTIMISE_H
#define CLOTHSIM_EXAMPLE_OPTIMISE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef double optimise_fn(const double *p, double *g, void *user);

typedef struct optimise_options {
    int    memory, iterations;      /* pairs kept, 1 where less is asked for; steps            */
    int    search;                  /* runs of one line search                                 */
    double first, most;             /* largest change of one number at the first step (Adam: at
                                       each), at any                                           */
    double slope, change;           /* ends when max |g| is below, or f falls by less than this
                                       part of itself in a step                                */
    void (*step)(int k, double f, const double *p, void *user);        /* told of each step    */
} optimise_options;

typedef enum optimise_end {
    OPTIMISE_SLOPE, OPTIMISE_CHANGE, OPTIMISE_ITERATIONS, OPTIMISE_STUCK, OPTIMISE_MEMORY
} optimise_end;

typedef struct optimise_result {
    double       f;                 /* at p as it is left, the best                            */
    int          iterations, runs, failed;
    optimise_end end;               /* STUCK: no step lowers f; or the first run failed        */
} optimise_result;

static inline optimise_options optimise_default(void) {
    optimise_options o;
    memset(&o, 0, sizeof o);
    o.memory = 10, o.iterations = 100, o.search = 20;
    o.first = 0.1, o.most = 2;
    o.slope = 0, o.change = 1e-9;
    return o;
}

static inline double optimise_dot(int n, const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

static inline double optimise_max(int n, const double *a) {
    double most = 0;
    for (int i = 0; i < n; i++) most = fmax(most, fabs(a[i]));
    return most;
}

static inline double optimise_run(optimise_fn *fn, void *user, int n, const double *p, double *g,
                                  optimise_result *r) {
    double f = fn(p, g, user);
    int    ok = isfinite(f);
    for (int i = 0; i < n && ok; i++) ok = isfinite(g[i]);
    r->runs++, r->failed += !ok;
    return ok ? f : HUGE_VAL;
}

typedef struct optimise_work {      /* of L-BFGS: one block, ring of pairs                     */
    int     n, m, kept, next;
    double *s, *y, *a;              /* [m x n], [m x n], [m]                                   */
    double *g, *d, *q, *h;          /* [n]: gradient, direction, p and gradient that are tried */
} optimise_work;

/* d = -B g */
static inline void optimise_direction(optimise_work *w) {
    const int n = w->n;
    for (int i = 0; i < n; i++) w->d[i] = -w->g[i];
    for (int k = 0; k < w->kept; k++) {
        const int     j = (w->next - 1 - k + 2 * w->m) % w->m;
        const double *s = w->s + (size_t)j * (size_t)n, *y = w->y + (size_t)j * (size_t)n;
        w->a[j] = optimise_dot(n, s, w->d) / optimise_dot(n, y, s);
        for (int i = 0; i < n; i++) w->d[i] -= w->a[j] * y[i];
        if (k > 0) continue;
        w->a[w->m] = optimise_dot(n, s, y) / optimise_dot(n, y, y);
    }
    for (int i = 0; i < n && w->kept > 0; i++) w->d[i] *= w->a[w->m];
    for (int k = w->kept - 1; k >= 0; k--) {
        const int     j = (w->next - 1 - k + 2 * w->m) % w->m;
        const double *s = w->s + (size_t)j * (size_t)n, *y = w->y + (size_t)j * (size_t)n;
        const double  b = w->a[j] - optimise_dot(n, y, w->d) / optimise_dot(n, y, s);
        for (int i = 0; i < n; i++) w->d[i] += b * s[i];
    }
}

/* Walks along d; 1 and *f, w->q, w->h when f was lowered. */
static inline int optimise_search(optimise_work *w, const double *p, double *f, double t,
                                  const optimise_options *o, optimise_fn *fn, void *user,
                                  optimise_result *r) {
    const double slope = optimise_dot(w->n, w->g, w->d), f0 = *f;
    double       lo = 0, hi = HUGE_VAL, at = 0;
    int          last = 0;                  /* 1: q and h are those of lo                      */
    for (int k = 0; k < o->search && -t * slope > o->change * fabs(f0); k++) {
        double v;
        for (int i = 0; i < w->n; i++) w->q[i] = p[i] + t * w->d[i];
        v = optimise_run(fn, user, w->n, w->q, w->h, r);
        last = 0;
        if (!(v <= f0 + 1e-4 * t * slope)) hi = t;
        else {
            *f = v, at = lo = t, last = 1;
            if (!(optimise_dot(w->n, w->h, w->d) < 0.9 * slope)) return 1;
        }
        t = hi < HUGE_VAL ? 0.5 * (lo + hi) : 2 * t;
        if (hi - lo < 1e-3 * hi && lo > 0) break;
    }
    if (at > 0 && !last) {                  /* a short step is one too                         */
        for (int i = 0; i < w->n; i++) w->q[i] = p[i] + at * w->d[i];
        *f = optimise_run(fn, user, w->n, w->q, w->h, r);
        return *f < f0;
    }
    return at > 0;
}

/* Takes the step to w->q over; a pair without curvature tells nothing. */
static inline void optimise_learn(optimise_work *w, double *p) {
    double *s = w->s + (size_t)w->next * (size_t)w->n, *y = w->y + (size_t)w->next * (size_t)w->n;
    for (int i = 0; i < w->n; i++) s[i] = w->q[i] - p[i], y[i] = w->h[i] - w->g[i];
    memcpy(p, w->q, (size_t)w->n * sizeof *p);
    memcpy(w->g, w->h, (size_t)w->n * sizeof *p);
    if (!(optimise_dot(w->n, s, y) > 1e-12 * sqrt(optimise_dot(w->n, s, s) *
                                                  optimise_dot(w->n, y, y)))) return;
    w->next = (w->next + 1) % w->m;
    if (w->kept < w->m) w->kept++;
}

static inline int optimise_work_make(optimise_work *w, int n, int memory) {
    const int    m = memory > 1 ? memory : 1;
    const size_t pairs = (size_t)m * (size_t)n, one = (size_t)n;
    memset(w, 0, sizeof *w);
    w->n = n, w->m = m;
    w->s = (double *)calloc(2 * pairs + (size_t)m + 1 + 4 * one, sizeof(double));
    if (w->s == NULL) return 0;
    w->y = w->s + pairs, w->a = w->y + pairs, w->g = w->a + m + 1;
    w->d = w->g + one, w->q = w->d + one, w->h = w->q + one;
    return 1;
}

/* Lowers fn from p [n], which it leaves at the best place. */
static inline optimise_result optimise_lbfgs(int n, double *p, optimise_fn *fn, void *user,
                                             const optimise_options *o) {
    optimise_result r = {HUGE_VAL, 0, 0, 0, OPTIMISE_MEMORY};
    optimise_work   w;
    double          f, before;
    if (!optimise_work_make(&w, n, o->memory)) return r;
    f = optimise_run(fn, user, n, p, w.g, &r);
    r.end = f < HUGE_VAL ? OPTIMISE_ITERATIONS : OPTIMISE_STUCK;
    while (f < HUGE_VAL && r.iterations < o->iterations) {
        double t = 1, size;
        if (optimise_max(n, w.g) <= o->slope) { r.end = OPTIMISE_SLOPE; break; }
        optimise_direction(&w);
        size = optimise_max(n, w.d);
        if (w.kept == 0) t = o->first / size;
        if (t * size > o->most) t = o->most / size;
        before = f;
        if (!optimise_search(&w, p, &f, t, o, fn, user, &r)) {
            f = before, r.end = OPTIMISE_STUCK;
            if (w.kept == 0) break;
            w.kept = 0, r.end = OPTIMISE_ITERATIONS;
            continue;
        }
        optimise_learn(&w, p);
        if (o->step) o->step(r.iterations, f, p, user);
        r.iterations++;
        if (before - f <= o->change * fabs(f)) { r.end = OPTIMISE_CHANGE; break; }
    }
    r.f = f;
    free(w.s);
    return r;
}

/* The same, by Adam: o->iterations runs. */
static inline optimise_result optimise_adam(int n, double *p, optimise_fn *fn, void *user,
                                            const optimise_options *o) {
    optimise_result r = {HUGE_VAL, 0, 0, 0, OPTIMISE_MEMORY};
    double         *w = (double *)calloc(4 * (size_t)n, sizeof *w), part = 1, b1 = 1, b2 = 1;
    double         *g = w, *m = w + n, *v = m + n, *best = v + n;
    if (w == NULL) return r;
    memcpy(best, p, (size_t)n * sizeof *p);
    r.end = OPTIMISE_ITERATIONS;
    while (r.iterations < o->iterations) {
        const double f = optimise_run(fn, user, n, p, g, &r);
        const double rate = part * o->first *
                            0.5 * (1 + cos(3.14159265358979 * r.iterations / o->iterations));
        if (f < r.f) r.f = f, memcpy(best, p, (size_t)n * sizeof *p);
        if (o->step) o->step(r.iterations, f, p, user);
        r.iterations++;
        if (!(f < HUGE_VAL)) {
            if (!(r.f < HUGE_VAL)) { r.end = OPTIMISE_STUCK; break; }
            memcpy(p, best, (size_t)n * sizeof *p);
            part *= 0.5;
            continue;
        }
        b1 *= 0.9, b2 *= 0.999;
        for (int i = 0; i < n; i++) {
            m[i] += 0.1 * (g[i] - m[i]), v[i] += 0.001 * (g[i] * g[i] - v[i]);
            p[i] -= rate * (m[i] / (1 - b1)) / (sqrt(v[i] / (1 - b2)) + 1e-12);
        }
    }
    memcpy(p, best, (size_t)n * sizeof *p);
    free(w);
    return r;
}

#endif
