/* exact.h - which pairs of triangles intersect, by exact arithmetic: slow and certain.
 *   n = exact_intersections(nv, x, nf, faces, pairs, max);       one state of a mesh
 *   exact_triangles(x, f, g)                                     one pair
 * For tests: it shares nothing with the kit but the definition, which is
 *
 *   Two faces intersect when the two closed triangles, as sets of points, have a point in common
 *   that is not on what they share by their vertex numbers: nothing, a vertex, or an edge. Touching
 *   counts. Faces with the same three vertices do not intersect. A triangle without area is the
 *   segment or the point that its corners span.
 *
 * The doubles are integers times a power of two, so that sums and products of them are integers:
 * no rounding anywhere. The common points of two triangles are a convex set, and a convex set lies
 * within the shared feature when its corners do. Its corners are ends of what one triangle leaves
 * of the edges of the other: a + t (b - a) is cut by plane and sides of the other triangle, t a
 * fraction. What doubles can tell apart for certain (the bounds are 5 times the rounding) is told
 * apart first; set exact_no_shortcuts to leave that out. */
#ifndef CLOTH_TEST_EXACT_H
#define CLOTH_TEST_EXACT_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static int exact_no_shortcuts;

/* --- integers --- */

#define EXACT_WORDS 640                     /* 8 factors of 2100 bits, and some                */

typedef struct exact_int {
    int      sign, n;                       /* -1 0 1; words in use, the last one not 0        */
    uint32_t w[EXACT_WORDS];                /* smallest first                                  */
} exact_int;

static void exact_copy(const exact_int *a, exact_int *out) {
    if (out == a) return;
    out->sign = a->sign;
    out->n = a->n;
    memcpy(out->w, a->w, (size_t)a->n * sizeof a->w[0]);
}

static void exact_small(int a, exact_int *out) {
    out->sign = (a > 0) - (a < 0);
    out->n = a != 0;
    out->w[0] = (uint32_t)(a < 0 ? -a : a);
}

static int exact_compare_size(const exact_int *a, const exact_int *b) {
    int i;
    if (a->n != b->n) return a->n < b->n ? -1 : 1;
    for (i = a->n - 1; i >= 0; i--)
        if (a->w[i] != b->w[i]) return a->w[i] < b->w[i] ? -1 : 1;
    return 0;
}

static void exact_trim(exact_int *a) {
    while (a->n && a->w[a->n - 1] == 0) a->n--;
    if (!a->n) a->sign = 0;
}

/* out = a + sign * b; out may be a or b. */
static void exact_sum(const exact_int *a, const exact_int *b, int sign, exact_int *out) {
    const int        sb = sign * b->sign, more = exact_compare_size(a, b);
    const exact_int *large = more >= 0 ? a : b, *small = more >= 0 ? b : a;
    const int        n = large->n, m = small->n, s = more >= 0 ? a->sign : sb;
    int              i;
    if (a->sign && sb && a->sign != sb) {
        int64_t borrow = 0;
        for (i = 0; i < n; i++) {
            int64_t d = (int64_t)large->w[i] - (i < m ? (int64_t)small->w[i] : 0) - borrow;
            borrow = d < 0;
            out->w[i] = (uint32_t)(d + (borrow << 32));
        }
        out->n = n;
    } else {
        uint64_t carry = 0;
        for (i = 0; i < n; i++) {
            carry += (uint64_t)large->w[i] + (i < m ? small->w[i] : 0u);
            out->w[i] = (uint32_t)carry;
            carry >>= 32;
        }
        out->n = n;
        if (carry) out->w[out->n++] = (uint32_t)carry;
    }
    out->sign = s;
    exact_trim(out);
}

/* out = a b; out is neither. */
static void exact_mul(const exact_int *a, const exact_int *b, exact_int *out) {
    int i, j;
    out->n = a->n + b->n;
    out->sign = a->sign * b->sign;
    if (out->n > EXACT_WORDS) abort();
    memset(out->w, 0, (size_t)out->n * sizeof out->w[0]);
    for (i = 0; i < a->n; i++) {
        uint64_t carry = 0;
        for (j = 0; j < b->n; j++) {
            carry += (uint64_t)a->w[i] * b->w[j] + out->w[i + j];
            out->w[i + j] = (uint32_t)carry;
            carry >>= 32;
        }
        out->w[i + b->n] = (uint32_t)carry;
    }
    exact_trim(out);
}

/* |x| = m 2^e with m odd; 0: m = 0. */
static uint64_t exact_parts(double x, int *e) {
    uint64_t m;
    int      power;
    if (!(fabs(x) > 0)) return 0;
    m = (uint64_t)ldexp(frexp(fabs(x), &power), 53);
    *e = power - 53;
    for (; !(m & 1u); m >>= 1) ++*e;
    return m;
}

/* x 2^-base. */
static void exact_from(double x, int base, exact_int *out) {
    int            e = 0, i;
    const uint64_t m = exact_parts(x, &e);
    out->sign = x > 0 ? 1 : -1;
    out->n = 0;
    if (m) {
        const int words = (e - base) / 32, bits = (e - base) % 32;
        for (i = 0; i < words; i++) out->w[out->n++] = 0;
        out->w[out->n++] = (uint32_t)(m << bits);
        out->w[out->n++] = (uint32_t)(m >> (32 - bits));
        out->w[out->n++] = bits ? (uint32_t)((m >> 32) >> (32 - bits)) : 0;
    }
    exact_trim(out);
}

/* --- vectors, fractions --- */

typedef struct exact_vec {
    exact_int c[3];
} exact_vec;

typedef struct exact_fraction {             /* num / den, den > 0 */
    exact_int num, den;
} exact_fraction;

static void exact_minus(const exact_vec *a, const exact_vec *b, exact_vec *out) {
    int k;
    for (k = 0; k < 3; k++) exact_sum(&a->c[k], &b->c[k], -1, &out->c[k]);
}

static void exact_dot(const exact_vec *a, const exact_vec *b, exact_int *out) {
    exact_int p;
    int       k;
    exact_small(0, out);
    for (k = 0; k < 3; k++) {
        exact_mul(&a->c[k], &b->c[k], &p);
        exact_sum(out, &p, 1, out);
    }
}

static void exact_cross(const exact_vec *a, const exact_vec *b, exact_vec *out) {
    exact_int p, q;
    int       k;
    for (k = 0; k < 3; k++) {
        exact_mul(&a->c[(k + 1) % 3], &b->c[(k + 2) % 3], &p);
        exact_mul(&a->c[(k + 2) % 3], &b->c[(k + 1) % 3], &q);
        exact_sum(&p, &q, -1, &out->c[k]);
    }
}

static int exact_is_zero(const exact_vec *a) {
    return !a->c[0].sign && !a->c[1].sign && !a->c[2].sign;
}

static void exact_fraction_set(const exact_int *num, const exact_int *den, exact_fraction *out) {
    exact_copy(num, &out->num);
    exact_copy(den, &out->den);
    if (out->den.sign < 0) {
        out->den.sign = 1;
        out->num.sign = -out->num.sign;
    }
}

static int exact_compare(const exact_fraction *a, const exact_fraction *b) {
    exact_int p, q;
    exact_mul(&a->num, &b->den, &p);
    exact_mul(&b->num, &a->den, &q);
    exact_sum(&p, &q, -1, &p);
    return p.sign;
}

/* 0 <= a <= 1 */
static int exact_within(const exact_fraction *a) {
    return a->num.sign >= 0 && exact_compare_size(&a->num, &a->den) <= 0;
}

/* --- points --- */

typedef struct exact_shared {               /* what the faces share: 0, 1 or 2 points          */
    int       n;
    exact_vec at[2];
} exact_shared;

/* point / den is on none of the shared point, segment. */
static int exact_beyond(const exact_vec *point, const exact_int *den, const exact_shared *s) {
    exact_vec from[2], along, c;
    exact_int p;
    int       i, k;
    if (s->n < 1) return 1;
    for (i = 0; i < s->n; i++)
        for (k = 0; k < 3; k++) {
            exact_mul(den, &s->at[i].c[k], &p);
            exact_sum(&point->c[k], &p, -1, &from[i].c[k]);
        }
    if (exact_is_zero(&from[0])) return 0;
    if (s->n == 1) return 1;
    if (exact_is_zero(&from[1])) return 0;
    exact_minus(&s->at[1], &s->at[0], &along);
    exact_cross(&from[0], &along, &c);
    if (!exact_is_zero(&c)) return 1;
    exact_dot(&from[0], &from[1], &p);      /* opposite ways to the ends: between them */
    return p.sign > 0;
}

/* The point a + t (b - a). */
static int exact_beyond_at(const exact_vec *a, const exact_vec *d, const exact_fraction *t,
                           const exact_shared *s) {
    exact_vec point;
    exact_int p, q;
    int       k;
    for (k = 0; k < 3; k++) {
        exact_mul(&a->c[k], &t->den, &p);
        exact_mul(&d->c[k], &t->num, &q);
        exact_sum(&p, &q, 1, &point.c[k]);
    }
    return exact_beyond(&point, &t->den, s);
}

/* --- a segment and a triangle with area --- */

/* What the sides of the triangle leave of [t0, t1] on a + t d; 0 when nothing. */
static int exact_cut(const exact_vec *a, const exact_vec *d, const exact_vec *tri,
                     const exact_vec *normal, exact_fraction *t0, exact_fraction *t1) {
    int i;
    for (i = 0; i < 3; i++) {               /* A + B t >= 0 */
        exact_vec      side, inward, from;
        exact_int      A, B;
        exact_fraction t;
        exact_minus(&tri[(i + 1) % 3], &tri[i], &side);
        exact_cross(normal, &side, &inward);
        exact_minus(a, &tri[i], &from);
        exact_dot(&inward, &from, &A);
        exact_dot(&inward, d, &B);
        if (B.sign == 0) {
            if (A.sign < 0) return 0;
            continue;
        }
        A.sign = -A.sign;
        exact_fraction_set(&A, &B, &t);
        if (B.sign > 0 ? exact_compare(&t, t0) > 0 : exact_compare(&t, t1) < 0) {
            exact_copy(&t.num, B.sign > 0 ? &t0->num : &t1->num);
            exact_copy(&t.den, B.sign > 0 ? &t0->den : &t1->den);
        }
    }
    return exact_compare(t0, t1) <= 0;
}

/* A point of the segment ab in the triangle, beyond what is shared. */
static int exact_segment_face(const exact_vec *a, const exact_vec *b, const exact_vec *tri,
                              const exact_vec *normal, const exact_shared *s) {
    exact_vec      d, to_plane;
    exact_int      rise, height, zero, one;
    exact_fraction t0, t1;
    exact_minus(b, a, &d);
    exact_minus(&tri[0], a, &to_plane);
    exact_dot(normal, &d, &rise);
    exact_dot(normal, &to_plane, &height);
    exact_small(0, &zero);
    exact_small(1, &one);
    if (rise.sign) {
        exact_fraction_set(&height, &rise, &t0);
        exact_fraction_set(&height, &rise, &t1);
        if (!exact_within(&t0)) return 0;
    } else {
        if (height.sign) return 0;
        exact_fraction_set(&zero, &one, &t0);
        exact_fraction_set(&one, &one, &t1);
    }
    if (!exact_cut(a, &d, tri, normal, &t0, &t1)) return 0;
    return exact_beyond_at(a, &d, &t0, s) || exact_beyond_at(a, &d, &t1, s);
}

/* --- two segments: only for triangles without area --- */

static int exact_on_segment(const exact_vec *p, const exact_vec *a, const exact_vec *b) {
    exact_shared s;
    exact_int    one;
    exact_small(1, &one);
    s.n = 2;
    s.at[0] = *a;
    s.at[1] = *b;
    return !exact_beyond(p, &one, &s);
}

static int exact_segments(const exact_vec *a, const exact_vec *b, const exact_vec *c,
                          const exact_vec *d, const exact_shared *s) {
    exact_vec      ab, cd, ac, m, v;
    exact_int      one, den, num, off;
    exact_fraction t, u;
    exact_small(1, &one);
    if ((exact_on_segment(a, c, d) && exact_beyond(a, &one, s)) ||
        (exact_on_segment(b, c, d) && exact_beyond(b, &one, s)) ||
        (exact_on_segment(c, a, b) && exact_beyond(c, &one, s)) ||
        (exact_on_segment(d, a, b) && exact_beyond(d, &one, s)))
        return 1;
    exact_minus(b, a, &ab);
    exact_minus(d, c, &cd);
    exact_minus(c, a, &ac);
    exact_cross(&ab, &cd, &m);
    exact_dot(&m, &ac, &off);
    if (exact_is_zero(&m) || off.sign) return 0;
    exact_dot(&m, &m, &den);
    exact_cross(&ac, &cd, &v);
    exact_dot(&v, &m, &num);
    exact_fraction_set(&num, &den, &t);
    exact_cross(&ac, &ab, &v);
    exact_dot(&v, &m, &num);
    exact_fraction_set(&num, &den, &u);
    return exact_within(&t) && exact_within(&u) && exact_beyond_at(a, &ab, &t, s);
}

/* --- what doubles can tell --- */

static double exact_det(const double *o, const double *a, const double *b, const double *c,
                        double *bound) {
    double p[3], q[3], r[3], det = 0, size = 0;
    int    k;
    for (k = 0; k < 3; k++) {
        p[k] = a[k] - o[k];
        q[k] = b[k] - o[k];
        r[k] = c[k] - o[k];
    }
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        det += p[k] * (q[i] * r[j] - q[j] * r[i]);
        size += fabs(p[k]) * (fabs(q[i] * r[j]) + fabs(q[j] * r[i]));
    }
    *bound = 1e-14 * size + 1e-290;
    return det;
}

/* The corners of g that are not shared are on one side of the plane of f. */
static int exact_one_side(const double *x, const int *f, const int *g, const int *common) {
    int k, side = 0;
    for (k = 0; k < 3; k++) {
        double bound, det;
        if (common[k]) continue;
        det = exact_det(x + 3 * f[0], x + 3 * f[1], x + 3 * f[2], x + 3 * g[k], &bound);
        if (!(fabs(det) > bound && fabs(det) < 1e290)) return 0;
        if (side && side != (det > 0 ? 1 : -1)) return 0;
        side = det > 0 ? 1 : -1;
    }
    return side != 0;
}

/* All of f strictly below, all of g strictly above a plane across w, but for a shared vertex o in
 * it. */
static int exact_parted(const double *w, const double *x, const int *f, const int *g,
                        const double *o, const int *f_common, const int *g_common, int shared) {
    double top = -HUGE_VAL, bottom = HUGE_VAL, size = 0;
    int    i, k;
    for (i = 0; i < 6; i++) {
        const double *p = x + 3 * (i < 3 ? f[i] : g[i - 3]);
        double        dot = 0, sum = 0;
        if (i < 3 ? f_common[i] : g_common[i - 3]) continue;
        for (k = 0; k < 3; k++) {
            dot += w[k] * (p[k] - o[k]);
            sum += fabs(w[k]) * fabs(p[k] - o[k]);
        }
        size = fmax(size, sum);
        if (i < 3) top = fmax(top, dot);
        else bottom = fmin(bottom, dot);
    }
    size = 1e-14 * size + 1e-290;
    if (!(size < 1e270)) return 0;
    return shared ? top < -size && bottom > size : bottom - top > 2 * size;
}

/* Where the edges of g at o point, less those of f: in a plane mesh of squares, cut in two, this
 * parts faces at one vertex whose edges are in line, as no normal of an edge does. */
static void exact_bisect(const double *x, const int *f, const int *g, const double *o, double *w) {
    int i, k;
    for (k = 0; k < 3; k++) w[k] = 0;
    for (i = 0; i < 6; i++) {
        const double *p = x + 3 * (i < 3 ? f[i] : g[i - 3]);
        double        size = 0;
        for (k = 0; k < 3; k++) size += (p[k] - o[k]) * (p[k] - o[k]);
        if (!(size > 0)) continue;
        for (k = 0; k < 3; k++) w[k] += (i < 3 ? o[k] - p[k] : p[k] - o[k]) / sqrt(size);
    }
}

static int exact_parted_somehow(const double *x, const int *f, const int *g, const double *o,
                                const int *f_common, const int *g_common, int shared) {
    double n[2][3], w[3];
    int    i, k, t;
    for (t = 0; t < 2; t++) {
        const int *s = t ? g : f;
        for (k = 0; k < 3; k++) {
            const int     i1 = (k + 1) % 3, i2 = (k + 2) % 3;
            const double *p = x + 3 * s[0], *q = x + 3 * s[1], *r = x + 3 * s[2];
            n[t][k] = (q[i1] - p[i1]) * (r[i2] - p[i2]) - (q[i2] - p[i2]) * (r[i1] - p[i1]);
        }
    }
    for (k = 0; k < 3; k++)
        w[k] = (x[3 * g[0] + k] + x[3 * g[1] + k] + x[3 * g[2] + k]) -
               (x[3 * f[0] + k] + x[3 * f[1] + k] + x[3 * f[2] + k]);
    if (exact_parted(w, x, f, g, o, f_common, g_common, shared)) return 1;
    if (shared) {
        exact_bisect(x, f, g, o, w);
        if (exact_parted(w, x, f, g, o, f_common, g_common, shared)) return 1;
    }
    for (i = 0; i < 12; i++) {
        const int *s = i % 2 ? g : f;
        for (k = 0; k < 3; k++) {
            const int     i1 = (k + 1) % 3, i2 = (k + 2) % 3;
            const double *p = x + 3 * s[i / 2 % 3], *q = x + 3 * s[(i / 2 + 1) % 3];
            w[k] = n[i % 2][i1] * (q[i2] - p[i2]) - n[i % 2][i2] * (q[i1] - p[i1]);
            if (i >= 6) w[k] = -w[k];
        }
        if (exact_parted(w, x, f, g, o, f_common, g_common, shared)) return 1;
    }
    return 0;
}

/* Two faces at one edge whose third corners lie on different sides of a plane through it. */
static int exact_opened(const double *x, const int *f, const int *g, const int *f_common,
                        const int *g_common) {
    const int     kf = f_common[0] ? f_common[1] ? 2 : 1 : 0;
    const int     kg = g_common[0] ? g_common[1] ? 2 : 1 : 0;
    const double *o = x + 3 * f[(kf + 1) % 3], *e = x + 3 * f[(kf + 2) % 3];
    const double *p = x + 3 * f[kf], *q = x + 3 * g[kg];
    double        dot = 0, size = 0;
    int           k;
    for (k = 0; k < 3; k++) {
        const int    i = (k + 1) % 3, j = (k + 2) % 3;
        const double a = (e[i] - o[i]) * (p[j] - o[j]), b = (e[j] - o[j]) * (p[i] - o[i]);
        const double c = (e[i] - o[i]) * (q[j] - o[j]), d = (e[j] - o[j]) * (q[i] - o[i]);
        dot += (a - b) * (c - d);
        size += (fabs(a) + fabs(b)) * (fabs(c) + fabs(d));
    }
    return dot < -1e-14 * size - 1e-290 && size < 1e290;
}

/* --- pairs --- */

static int exact_shortcut(const double *x, const int *f, const int *g, const int *f_common,
                          const int *g_common, int shared) {
    const double *o = x + 3 * f[0];
    int           k;
    if (exact_one_side(x, f, g, g_common) || exact_one_side(x, g, f, f_common)) return 1;
    if (shared == 2) return exact_opened(x, f, g, f_common, g_common);
    for (k = 0; k < 3; k++)
        if (f_common[k]) o = x + 3 * f[k];
    return exact_parted_somehow(x, f, g, o, f_common, g_common, shared);
}

/* The sign of exact_det(), 0 where rounding may have made it. */
static int exact_sign(const double *x, int o, int a, int b, int c) {
    double       bound;
    const double det = exact_det(x + 3 * o, x + 3 * a, x + 3 * b, x + 3 * c, &bound);
    return fabs(det) > bound && fabs(det) < 1e290 ? (det > 0 ? 1 : -1) : 0;
}

/* An edge of one goes through the inside of the other. */
static int exact_through(const double *x, const int *f, const int *g) {
    int i;
    for (i = 0; i < 6; i++) {
        const int *s = i < 3 ? f : g, *t = i < 3 ? g : f, p = s[i % 3], q = s[(i + 1) % 3];
        const int  side = exact_sign(x, t[0], t[1], t[2], p);
        int        turn;
        if (!side || exact_sign(x, t[0], t[1], t[2], q) != -side) continue;
        turn = exact_sign(x, p, q, t[0], t[1]);
        if (turn && exact_sign(x, p, q, t[1], t[2]) == turn &&
            exact_sign(x, p, q, t[2], t[0]) == turn)
            return 1;
    }
    return 0;
}

/* The power of two that all six corners are multiples of. */
static int exact_base(const double *x, const int *f, const int *g) {
    int base = 0, any = 0, i, k, e = 0;
    for (i = 0; i < 6; i++)
        for (k = 0; k < 3; k++) {
            if (!exact_parts(x[3 * (i < 3 ? f[i] : g[i - 3]) + k], &e)) continue;
            base = any && base < e ? base : e;
            any = 1;
        }
    return base;
}

static int exact_slowly(const double *x, const int *f, const int *g, const int *f_common) {
    static exact_vec    p[6], normal[2];
    static exact_shared s;
    const int           base = exact_base(x, f, g);
    exact_vec           e0, e1;
    int                 i, j, k, t;
    for (i = 0; i < 6; i++)
        for (k = 0; k < 3; k++)
            exact_from(x[3 * (i < 3 ? f[i] : g[i - 3]) + k], base, &p[i].c[k]);
    for (t = 0; t < 2; t++) {
        exact_minus(&p[3 * t + 1], &p[3 * t], &e0);
        exact_minus(&p[3 * t + 2], &p[3 * t], &e1);
        exact_cross(&e0, &e1, &normal[t]);
    }
    s.n = 0;
    for (i = 0; i < 3; i++)
        if (f_common[i]) s.at[s.n++] = p[i];
    for (t = 0; t < 2; t++)
        for (i = 0; i < 3 && !exact_is_zero(&normal[1 - t]); i++)
            if (exact_segment_face(&p[3 * t + i], &p[3 * t + (i + 1) % 3], p + 3 * (1 - t),
                                   &normal[1 - t], &s))
                return 1;
    if (!exact_is_zero(&normal[0]) || !exact_is_zero(&normal[1])) return 0;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (exact_segments(&p[i], &p[(i + 1) % 3], &p[3 + j], &p[3 + (j + 1) % 3], &s))
                return 1;
    return 0;
}

/* Faces f [3], g [3] of x, finite: 1 when they intersect. A face may not name a vertex twice. */
static inline int exact_triangles(const double *x, const int *f, const int *g) {
    int f_common[3] = {0, 0, 0}, g_common[3] = {0, 0, 0}, shared = 0, i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (f[i] == g[j]) {
                f_common[i] = g_common[j] = 1;
                shared++;
            }
    if (shared == 3) return 0;
    if (!exact_no_shortcuts && exact_shortcut(x, f, g, f_common, g_common, shared)) return 0;
    if (!exact_no_shortcuts && exact_through(x, f, g)) return 1;
    return exact_slowly(x, f, g, f_common);
}

/* The narrower answer that many programs give: 1 when the faces name no common vertex and an edge
 * of one passes from one side of the other to the other side, within its sides. An edge that passes
 * through an edge, or touches, does not count. */
static inline int exact_pierce(const double *x, const int *f, const int *g) {
    static exact_vec p[6], normal[2];
    const int        base = exact_base(x, f, g);
    exact_vec        d, e, inward;
    exact_int        rise, height, a, b, c;
    exact_fraction   at;
    int              i, j, k, t;
    for (i = 0; i < 9; i++)
        if (f[i / 3] == g[i % 3]) return 0;
    for (i = 0; i < 6; i++)
        for (k = 0; k < 3; k++)
            exact_from(x[3 * (i < 3 ? f[i] : g[i - 3]) + k], base, &p[i].c[k]);
    for (t = 0; t < 2; t++) {
        exact_minus(&p[3 * t + 1], &p[3 * t], &d);
        exact_minus(&p[3 * t + 2], &p[3 * t], &e);
        exact_cross(&d, &e, &normal[t]);
    }
    for (i = 0; i < 6; i++) {               /* edge i against the other triangle */
        const exact_vec *from = &p[i], *tri = i < 3 ? p + 3 : p, *n = &normal[i < 3];
        int              in = 1;
        exact_minus(&p[i % 3 == 2 ? i - 2 : i + 1], from, &d);
        exact_minus(&tri[0], from, &e);
        exact_dot(n, &d, &rise);
        exact_dot(n, &e, &height);
        if (!rise.sign) continue;
        exact_fraction_set(&height, &rise, &at);
        if (at.num.sign <= 0 || exact_compare_size(&at.num, &at.den) >= 0) continue;
        for (j = 0; j < 3; j++) {
            exact_minus(&tri[(j + 1) % 3], &tri[j], &e);
            exact_cross(n, &e, &inward);
            exact_minus(from, &tri[j], &e);
            exact_dot(&inward, &e, &a);
            exact_dot(&inward, &d, &b);
            exact_mul(&a, &at.den, &c);
            exact_mul(&b, &at.num, &a);
            exact_sum(&c, &a, 1, &c);
            in = in && c.sign > 0;
        }
        if (in) return 1;
    }
    return 0;
}

/* --- a mesh --- */

typedef struct exact_item {
    double lo[3], hi[3];
    int    face;
} exact_item;

static int exact_axis;

static int exact_order(const void *a, const void *b) {
    const exact_item *p = (const exact_item *)a, *q = (const exact_item *)b;
    if (p->lo[exact_axis] < q->lo[exact_axis]) return -1;
    if (p->lo[exact_axis] > q->lo[exact_axis]) return 1;
    return p->face < q->face ? -1 : 1;
}

static int exact_order_pairs(const void *a, const void *b) {
    const int *p = (const int *)a, *q = (const int *)b;
    return p[0] != q[0] ? (p[0] < q[0] ? -1 : 1) : p[1] < q[1] ? -1 : p[1] > q[1];
}

/* Face boxes in order of their lower ends along the mesh's longest axis. */
static exact_item *exact_items(const double *x, int nf, const int *faces) {
    exact_item *item = (exact_item *)malloc(((size_t)nf + 1u) * sizeof *item);
    double      lo[3], hi[3];
    int         i, k, c;
    if (!item) abort();
    for (k = 0; k < 3; k++) {
        lo[k] = HUGE_VAL;
        hi[k] = -HUGE_VAL;
        for (i = 0; i < nf; i++) {
            item[i].face = i;
            item[i].lo[k] = HUGE_VAL;
            item[i].hi[k] = -HUGE_VAL;
            for (c = 0; c < 3; c++) {
                item[i].lo[k] = fmin(item[i].lo[k], x[3 * faces[3 * i + c] + k]);
                item[i].hi[k] = fmax(item[i].hi[k], x[3 * faces[3 * i + c] + k]);
            }
            lo[k] = fmin(lo[k], item[i].lo[k]);
            hi[k] = fmax(hi[k], item[i].hi[k]);
        }
    }
    exact_axis = hi[0] - lo[0] > hi[1] - lo[1] ? 0 : 1;
    if (hi[2] - lo[2] > hi[exact_axis] - lo[exact_axis]) exact_axis = 2;
    qsort(item, (size_t)nf, sizeof *item, exact_order);
    return item;
}

/* Pairs i < j of faces [nf x 3] that intersect at the finite positions x [nv x 3]: their number,
 * and the first max of them in pairs [max x 2] (NULL when max is 0), in increasing order. */
static inline int exact_intersections(int nv, const double *x, int nf, const int *faces, int *pairs,
                                      int max) {
    exact_item *item = exact_items(x, nf, faces);
    int        *found = NULL, count = 0, room = 0, i, j;
    const int   a = exact_axis, b = (a + 1) % 3, c = (a + 2) % 3;
    (void)nv;
    for (i = 0; i < nf; i++)
        for (j = i + 1; j < nf && item[j].lo[a] <= item[i].hi[a]; j++) {
            const int f = item[i].face < item[j].face ? item[i].face : item[j].face;
            const int g = item[i].face < item[j].face ? item[j].face : item[i].face;
            if (item[j].lo[b] > item[i].hi[b] || item[i].lo[b] > item[j].hi[b] ||
                item[j].lo[c] > item[i].hi[c] || item[i].lo[c] > item[j].hi[c] ||
                !exact_triangles(x, faces + 3 * f, faces + 3 * g))
                continue;
            if (count == room) {
                room = 2 * room + 64;
                found = (int *)realloc(found, 2 * (size_t)room * sizeof *found);
                if (!found) abort();
            }
            found[2 * count] = f;
            found[2 * count + 1] = g;
            count++;
        }
    if (count) qsort(found, (size_t)count, 2 * sizeof *found, exact_order_pairs);
    for (i = 0; i < 2 * (count < max ? count : max); i++) pairs[i] = found[i];
    free(found);
    free(item);
    return count;
}

#endif
