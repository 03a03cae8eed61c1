/* clothsim_collide.h - what cloth may not pass through.                       version 0.1.0
 * SPDX-License-Identifier: MIT
 *
 * Collisions for clothsim.h: continuous detection, impact zones solved by a quadratic program,
 * a proximity potential and friction inside the implicit step. C99, libc and libm only.
 *
 * In ONE .c file:        #define CLOTHSIM_IMPLEMENTATION
 *                        #include "clothsim_collide.h"
 * everywhere else:       #include "clothsim_collide.h"         (it includes clothsim.h)
 *
 * CONTENTS
 *   the interface
 *     [2.1] CONTINUOUS DETECTION             [2.2] QUADRATIC PROGRAM
 *     [2.3] INTERSECTIONS                    [2.4] DISTANCE GRID
 *     [2.5] CONTACT
 *   the implementation, bottom-up
 *     [3.1] EXACT SIGNS                      [3.2] DISTANCES
 *     [4.1] CONTINUOUS DETECTION
 *     [5.1] HIERARCHY                        [5.2] TRIANGLES THAT INTERSECT
 *     [6.1] QUADRATIC PROGRAM
 *     [7.1] DISTANCE GRID                    [7.2] OBSTACLES THAT PENETRATE THEMSELVES
 *     [8.1] SCENE                            [8.2] PROXIMITY AND FRICTION
 *     [8.3] IMPACT ZONES                     [8.4] THE CONTACT IN THE STEP
 *     [8.5] QUERIES                          [9.1] CHANGES
 */

#ifndef CLOTHSIM_COLLIDE_H
#define CLOTHSIM_COLLIDE_H

#include "clothsim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.1] CONTINUOUS DETECTION ============================================================
 *
 * Four points move on straight lines from xa [4x3] at t = 0 to xb [4x3] at t = 1 (m). vf: a vertex,
 * then the corners of a face. ee: both ends of one edge, then both ends of the other.
 *
 * Returns 1 and *toi in [0,1] when the two come within min_sep (m; below 0 counts as 0) of each
 * other, else 0 (*toi is then 1). toi may be NULL.
 *   - Never 0 for a true contact: coplanar motion, parallel edges, edges and faces of no length or
 *     area, contact at the start or at the end, any scale.
 *   - At every time before *toi the distance is greater than min_sep. At *toi it is at most
 *     min_sep + 1e-6 min_sep + 3e-14 size, size the largest difference between the two; only
 *     where a sliver turns far, after 256 steps, can it be more.
 *   - Within min_sep at the start: 1 and 0, also when the two part.
 *   - 1 is a false alarm where the least distance is between min_sep and that. With min_sep = 0 a
 *     second look with twice the digits leaves those below 1e-28 size.
 * A number that is not finite: 1 and 0. Cost: 0.05 to 0.3 us without contact, 1 to 2 us with; with
 * min_sep = 0, touching without crossing, on a side, say, or along a line, up to 100 us. */
CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi);
CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi);

/* ===== [2.2] QUADRATIC PROGRAM =============================================================== */

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* ===== [2.4] DISTANCE GRID =================================================================== */

/* ===== [2.5] CONTACT ========================================================================= */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_COLLIDE_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_COLLIDE_IMPLEMENTED)
#define CLOTHSIM_COLLIDE_IMPLEMENTED

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] EXACT SIGNS =====================================================================
 *
 * The sign of a determinant of coordinates, exact. A floating evaluation with an error bound
 * answers nearly always; the rest is worked out without rounding. [Shewchuk 1997, Adaptive
 * precision floating-point arithmetic and fast robust geometric predicates, Discrete &
 * Computational Geometry 18, theorems 6, 7, 10, 18; doi 10.1007/PL00009321]
 *
 *     a + b  =  s + r     s the rounded sum, r what rounding lost, both doubles (two_sum)
 *     a * b  =  p + r     likewise, from halves of 26 bits of a and b (Dekker's product)
 *
 * An expansion is a sum of doubles whose bits do not overlap, smallest first: its sign is that of
 * the last one. Sums and products of expansions are built by adding one double after the other,
 * which is quadratic in the length and never long here.
 *
 * Range: exact for coordinates that are 0 or have 1e-85 < |x| < 1e85. Below, products underflow.
 * Halves are cut by the bits of the number, so contraction to fused multiply-adds cannot change
 * them.
 *
 * checked: tests/test_exact.c */

CLOTHI_UNUSED static void clothi_two_sum(double a, double b, double *s, double *r) {
    const double sum = a + b, bv = sum - a, av = sum - bv;
    *s = sum;
    *r = (a - av) + (b - bv);
}

/* a = hi + the rest, both of at most 26 bits. */
CLOTHI_UNUSED static double clothi_high_half(double a) {
    uint64_t bits;
    memcpy(&bits, &a, sizeof bits);
    bits = (bits + 0x4000000u) & ~(uint64_t)0x7ffffffu;
    memcpy(&a, &bits, sizeof a);
    return a;
}

/* Out of line: where it is inlined a compiler may fuse p into the caller's next sum. */
CLOTHI_OUTLINE static void clothi_two_product(double a, double b, double *p, double *r) {
    const double ah = clothi_high_half(a), al = a - ah, bh = clothi_high_half(b), bl = b - bh;
    *p = a * b;
    *r = al * bl - (((*p - ah * bh) - al * bh) - ah * bl);
}

/* e [n] += b; returns the new length, at most n + 1. Zeros are left out; 0 has length 1 or 0. */
CLOTHI_UNUSED static int clothi_exp_grow(double *e, int n, double b) {
    double q = b, r;
    int    i, m = 0;
    for (i = 0; i < n; i++) {
        clothi_two_sum(q, e[i], &q, &r);
        if (r != 0) e[m++] = r;
    }
    if (q != 0 || m == 0) e[m++] = q;
    return m;
}

/* out [na + nb] = a + sign b, out not a or b. */
CLOTHI_UNUSED static int clothi_exp_sum(const double *a, int na, const double *b, int nb,
                                        double sign, double *out) {
    int i, n = na;
    for (i = 0; i < na; i++) out[i] = a[i];
    for (i = 0; i < nb; i++) n = clothi_exp_grow(out, n, sign * b[i]);
    return n;
}

/* out [2 na] = a s. */
CLOTHI_UNUSED static int clothi_exp_scale(const double *a, int na, double s, double *out) {
    int i, n = 0;
    for (i = 0; i < na; i++) {
        double p, r;
        clothi_two_product(a[i], s, &p, &r);
        n = clothi_exp_grow(out, n, r);
        n = clothi_exp_grow(out, n, p);
    }
    return n;
}

/* out [2 na nb] = a b. */
CLOTHI_UNUSED static int clothi_exp_product(const double *a, int na, const double *b, int nb,
                                            double *out) {
    int i, k, n = 0;
    for (i = 0; i < na; i++)
        for (k = 0; k < nb; k++) {
            double p, r;
            clothi_two_product(a[i], b[k], &p, &r);
            n = clothi_exp_grow(out, n, r);
            n = clothi_exp_grow(out, n, p);
        }
    return n;
}

CLOTHI_UNUSED static int clothi_exp_sign(const double *e, int n) {
    const double top = n > 0 ? e[n - 1] : 0;
    return (top > 0) - (top < 0);
}

/* out [2] = a - b. */
CLOTHI_UNUSED static void clothi_exp_difference(double a, double b, double *out) {
    clothi_two_sum(a, -b, out + 1, out);
}

/* out [16] = a d - b c, each of two doubles; returns the length. */
CLOTHI_UNUSED static int clothi_exp_minor(const double *a, const double *b, const double *c,
                                          const double *d, double *out) {
    double    p[8], q[8];
    const int np = clothi_exp_product(a, 2, d, 2, p), nq = clothi_exp_product(b, 2, c, 2, q);
    return clothi_exp_sum(p, np, q, nq, -1, out);
}

/* Sign of (a-c) x (b-c): 1 when a, b, c [2] turn counter-clockwise, 0 on one line. */
CLOTHI_UNUSED static int clothi_orient2d(const double *a, const double *b, const double *c) {
    const double p = (a[0] - c[0]) * (b[1] - c[1]), q = (a[1] - c[1]) * (b[0] - c[0]);
    const double det = p - q, bound = 4.5e-16 * (fabs(p) + fabs(q));  /* 3 roundings of 2^-53 */
    double       u[2][2], v[2][2], e[16];
    int          i;
    if (det > bound || -det > bound) return det > 0 ? 1 : -1;
    for (i = 0; i < 2; i++) {
        clothi_exp_difference(a[i], c[i], u[i]);
        clothi_exp_difference(b[i], c[i], v[i]);
    }
    return clothi_exp_sign(e, clothi_exp_minor(u[0], u[1], v[0], v[1], e));
}

/* Sign of (a-d) . (b-d) x (c-d): 1 when a, b, c turn counter-clockwise seen from the side that d
 * is not on, 0 in one plane. */
CLOTHI_UNUSED static int clothi_orient3d(const double *a, const double *b, const double *c,
                                         const double *d) {
    const double *x[3];
    double        w[3][3], e[3][3][2], m[16], part[64], sum[192], old[192], det = 0, bound = 0;
    int           i, k, n = 0;
    x[0] = a;
    x[1] = b;
    x[2] = c;
    for (i = 0; i < 3; i++) clothi_sub3(x[i], d, w[i]);
    for (i = 0; i < 3; i++) {
        const int    j = (i + 1) % 3, l = (i + 2) % 3;
        const double p = w[1][j] * w[2][l], q = w[1][l] * w[2][j];
        det += w[0][i] * (p - q);
        bound += fabs(w[0][i]) * (fabs(p) + fabs(q));
    }
    bound *= 1.2e-15;                       /* at most 9 roundings of 2^-53 in each product     */
    if (det > bound || -det > bound) return det > 0 ? 1 : -1;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) clothi_exp_difference(x[i][k], d[k], e[i][k]);
    for (i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, l = (i + 2) % 3;
        const int nm = clothi_exp_minor(e[1][j], e[1][l], e[2][j], e[2][l], m);
        const int np = clothi_exp_product(m, nm, e[0][i], 2, part);
        memcpy(old, sum, sizeof(double) * (size_t)n);
        n = clothi_exp_sum(old, n, part, np, 1, sum);
    }
    return clothi_exp_sign(sum, n);
}

/* ===== [3.2] DISTANCES =======================================================================
 *
 * Vertex and face, edge and edge are one problem: how near does a flat polygon of differences
 * r_k come to the origin?
 *
 *     vertex p, face a b c      r = p - a, p - b, p - c                          a triangle
 *     edges a0 a1, b0 b1        r = a0 - b0, a1 - b0, a1 - b1, a0 - b1           a parallelogram
 *
 * In differences the error is relative to the size of the pair, not to its coordinates. The
 * nearest point is the foot of the perpendicular when that is inside, else it is on a side of the
 * polygon. All candidates are points of the polygon and the least is taken: a polygon of no area
 * or a side of no length leaves the other candidates.
 *
 * checked: tests/test_ccd.c */

/* Differences of the pair x [4x3] into r [4x3]; returns how many there are: 3 or 4. */
CLOTHI_UNUSED static int clothi_pair_polygon(int edge_edge, const double *x, double *r) {
    if (!edge_edge) {
        clothi_sub3(x, x + 3, r);
        clothi_sub3(x, x + 6, r + 3);
        clothi_sub3(x, x + 9, r + 6);
        return 3;
    }
    clothi_sub3(x, x + 6, r);
    clothi_sub3(x + 3, x + 6, r + 3);
    clothi_sub3(x + 3, x + 9, r + 6);
    clothi_sub3(x, x + 9, r + 9);
    return 4;
}

/* The point v [3] of the polygon r [n x 3] nearest to the origin: v = sum lambda_k r_k. Returns
 * its side, from corner k to k + 1, or -1 inside. Needs |r| < 1e70, exact down to 1e-70. */
CLOTHI_UNUSED static int clothi_nearest(const double *r, int n, double *lambda, double *v) {
    double e1[3], e2[3], normal[3], c[3], best = HUGE_VAL, at = 0, nn;
    int    i, k, side = 0;
    for (i = 0; i < n; i++) {
        const double *a = r + 3 * i, *b = r + 3 * (i + 1 < n ? i + 1 : 0);
        double        e[3], p[3], ee, ae, t, d2;
        clothi_sub3(b, a, e);
        ee = clothi_dot3(e, e);
        ae = -clothi_dot3(a, e);
        t = !(ae > 0) ? 0 : ae < ee ? ae / ee : 1;
        for (k = 0; k < 3; k++) p[k] = t < 1 ? a[k] + t * e[k] : b[k];
        d2 = clothi_dot3(p, p);
        if (d2 < best) {
            best = d2;
            at = t;
            side = i;
            memcpy(v, p, sizeof p);
        }
    }
    memset(lambda, 0, 4 * sizeof *lambda);
    lambda[side] = 1 - at;
    lambda[side + 1 < n ? side + 1 : 0] = at;
    clothi_sub3(r + 3, r, e1);
    clothi_sub3(r + 3 * (n - 1), r, e2);
    clothi_cross3(e1, e2, normal);
    nn = clothi_dot3(normal, normal);
    if (nn > 0) {
        double s, t, p[3], d2;
        clothi_cross3(e2, r, c);
        s = clothi_dot3(c, normal);
        clothi_cross3(r, e1, c);
        t = clothi_dot3(c, normal);
        if (s < 0 || t < 0 || (n == 3 ? s + t > nn : s > nn || t > nn)) return side;
        s /= nn;
        t /= nn;
        for (k = 0; k < 3; k++) p[k] = r[k] + s * e1[k] + t * e2[k];
        d2 = clothi_dot3(p, p);
        if (d2 < best) {
            memcpy(v, p, sizeof p);
            lambda[0] = n == 3 ? 1 - s - t : (1 - s) * (1 - t);
            lambda[1] = n == 3 ? s : s * (1 - t);
            lambda[2] = n == 3 ? t : s * t;
            lambda[3] = n == 3 ? 0 : (1 - s) * t;
            side = -1;
        }
    }
    return side;
}

/* Weights of the four points, of sum 0, from those of the polygon's corners. */
CLOTHI_UNUSED static void clothi_pair_weights(int edge_edge, const double *lambda, double *w) {
    if (edge_edge) {
        w[1] = lambda[1] + lambda[2];
        w[0] = 1 - w[1];
        w[3] = -(lambda[2] + lambda[3]);
        w[2] = -1 - w[3];
    } else {
        w[0] = 1;
        w[2] = -lambda[1];
        w[3] = -lambda[2];
        w[1] = -1 - w[2] - w[3];
    }
}

/* The power of two that takes m > 0 to [1/2, 1), as far as doubles go. */
CLOTHI_UNUSED static double clothi_unit_scale(double m) {
    int e;
    (void)frexp(m, &e);
    return ldexp(1.0, e < -1022 ? 1022 : e > 1022 ? -1022 : -e);
}

CLOTHI_UNUSED static double clothi_pair_distance(int edge_edge, const double *x, double *w) {
    double    r[12], lambda[4], v[3], m = 0, scale = 1;
    const int n = clothi_pair_polygon(edge_edge, x, r);
    int       i;
    for (i = 0; i < 3 * n; i++) m = clothi_max(m, fabs(r[i]));
    if (m > 0 && !(m > 1e-60 && m < 1e60)) {
        scale = clothi_unit_scale(m);
        for (i = 0; i < 3 * n; i++) r[i] *= scale;
    }
    clothi_nearest(r, n, lambda, v);
    clothi_pair_weights(edge_edge, lambda, w);
    return sqrt(clothi_dot3(v, v)) / scale;
}

/* Distance of the vertex x [3] from the face of the next three points, m; w [4]: 1 and minus the
 * barycentric coordinates of the nearest point, so that sum w_i x_i spans the distance. */
CLOTHI_UNUSED static double clothi_point_triangle(const double *x, double *w) {
    return clothi_pair_distance(0, x, w);
}

/* Distance of the edge x [2x3] from the edge of the next two points, m; w [4]: weights of the
 * nearest points, positive for the first edge, negative for the second. */
CLOTHI_UNUSED static double clothi_edge_edge(const double *x, double *w) {
    return clothi_pair_distance(1, x, w);
}

/* ===== [4.1] CONTINUOUS DETECTION ============================================================
 *
 * The polygon of differences r_k(t) of section [3.2] must keep away from the origin by more than
 * s = min_sep. Time goes forward from one certified moment to the next, never by a root that was
 * merely computed [Mirtich 1996, Impulse-based dynamic simulation of rigid body systems, thesis,
 * chapter 2, conservative advancement]:
 *
 *        n                      one fixed direction n, the one to the nearest point at t:
 *     ---^--------- r_k         n.r_k is linear in t. As long as n.r_k > s for every corner the
 *        | s   o                plane stays between the polygon and the ball around the origin.
 *
 *     n(t) = n + x W            the same with a direction that turns with the side or plane that
 *                               the nearest point is on: n(t).r_k is quadratic, and near contact
 *                               the steps converge as those of Newton's method.
 *
 *     c(t) = det(e1, e2, r_0)   the polygon's own plane, e1 and e2 its sides: a cubic.
 *                               |c| > s |e1 x e2| as long as the plane misses the ball.
 *
 * The first two also hold for polygons of no area and pass beside a polygon; the third bridges
 * what is far from contact and slow approach. Polynomials, and the bound |e1 x e2| <= sum B_i
 * |n_i|, are in Bernstein form: the first point of the axis that their convex hull reaches is a
 * safe time. The furthest of the three counts. Contact is what none can exclude; for s = 0 it is
 * asked again with twice the digits.
 *
 * Rounding. u = 2^-53, m = the largest |difference|. A corner of r(t) is off by at most 4 u m per
 * axis, a product n.r with |n| = 1 by 13 u m in all: E = 16 u m is kept between s and what counts
 * as free, twice as much where a root of the linear function is taken, and four times as much,
 * times 1 + |W|, for the quadratic. The coefficients of c are off by at most 64 u m e^2, e the
 * largest |side|, splitting by 108 u m e^2, the root by 72 u m e^2: 256 u m e^2 is kept. m is
 * brought to about 1 by a power of two when it is beyond 1e-30 .. 1e30; sides below 1e-60 then
 * have no plane, as products of them underflow.
 *
 * checked: tests/test_ccd.c, tests/fuzz_ccd.c */

#define CLOTHI_CCD_STEPS 256                /* then contact: grazes by less than it can tell    */
#define CLOTHI_CCD_NEAR  (1.0 / 1048576)    /* contact: within s (1 + this)                     */

typedef struct clothi_ccd {
    int    n;                               /* corners                                          */
    double r0[12], r1[12];                  /* [n x 3] at t = 0 and 1                           */
    double s, m, E, scale;
    double floor;                           /* n.r above this is certainly above s              */
    int    has_cubic;
    double c[4], N[4];                      /* Bernstein on [0,1]: cubic, bound of its normal   */
    double e, E_c;                          /* largest |side|                                   */
} clothi_ccd;

/* Longest certified time from t with the fixed direction n, |n| = 1: t when there is none, 2 when
 * it lasts to the end. */
CLOTHI_UNUSED static double clothi_ccd_axis(const clothi_ccd *q, const double *n, double t) {
    double until = 2;
    int    k;
    for (k = 0; k < q->n; k++) {
        const double h0 = clothi_dot3(n, q->r0 + 3 * k), h1 = clothi_dot3(n, q->r1 + 3 * k);
        if (!((1 - t) * h0 + t * h1 > q->floor)) return t;
        if (!(h1 > q->floor)) until = clothi_min(until, (h0 - q->floor) / (h0 - h1));
    }
    return clothi_max(t, until);
}

/* Bernstein coefficients of the cubic and of the bound of its normal's length. */
CLOTHI_UNUSED static void clothi_ccd_cubic(clothi_ccd *q) {
    double a[2][3], b[2][3], n[3][3], p[3], e = 0, N[3];
    int    i, k;
    for (i = 0; i < 2; i++) {
        const double *r = i ? q->r1 : q->r0;
        clothi_sub3(r + 3, r, a[i]);
        clothi_sub3(r + 3 * (q->n - 1), r, b[i]);
        for (k = 0; k < 3; k++) e = clothi_max(e, clothi_max(fabs(a[i][k]), fabs(b[i][k])));
    }
    clothi_cross3(a[0], b[0], n[0]);
    clothi_cross3(a[0], b[1], n[1]);
    clothi_cross3(a[1], b[0], p);
    clothi_cross3(a[1], b[1], n[2]);
    for (k = 0; k < 3; k++) n[1][k] = 0.5 * (n[1][k] + p[k]);
    for (k = 0; k < 3; k++) N[k] = sqrt(clothi_dot3(n[k], n[k]));
    q->c[0] = clothi_dot3(n[0], q->r0);
    q->c[1] = (clothi_dot3(n[0], q->r1) + 2 * clothi_dot3(n[1], q->r0)) / 3;
    q->c[2] = (clothi_dot3(n[2], q->r0) + 2 * clothi_dot3(n[1], q->r1)) / 3;
    q->c[3] = clothi_dot3(n[2], q->r1);
    q->N[0] = N[0];
    q->N[1] = (N[0] + 2 * N[1]) / 3;
    q->N[2] = (N[2] + 2 * N[1]) / 3;
    q->N[3] = N[2];
    q->e = e;                               /* 2^-45; no plane where products underflow         */
    q->E_c = e > 1e-60 ? 2.842170943040401e-14 * q->m * e * e : HUGE_VAL;
    q->has_cubic = 1;
}

/* f [4] on [0,1] becomes f on [t,1]. */
CLOTHI_UNUSED static void clothi_bernstein_right(double *f, double t) {
    int i, k;
    for (k = 3; k > 0; k--)
        for (i = 0; i < k; i++) f[i] = (1 - t) * f[i] + t * f[i + 1];
}

/* f [4] on [0,1] becomes f on [0,t]. */
CLOTHI_UNUSED static void clothi_bernstein_left(double *f, double t) {
    int i, k;
    for (k = 1; k < 4; k++)
        for (i = 3; i >= k; i--) f[i] = (1 - t) * f[i - 1] + t * f[i];
}

/* Where the hull of f [n + 1] on [0,1], f[0] > 0, first meets 0; 2 when it does not. */
CLOTHI_UNUSED static double clothi_bernstein_first(const double *f, int n) {
    double first = 2;
    int    i, k;
    for (i = 1; i <= n; i++)
        for (k = 0; !(f[i] > 0) && k < i; k++)
            if (f[k] > 0)
                first = clothi_min(first, (k + (i - k) * (f[k] / (f[k] - f[i]))) / n);
    return first;
}

/* How fast n [3] must turn, W [3] from t to the end, to stay at right angles to the side or, for
 * -1, to the plane of the polygon, which is r now: W.e = -n.(change of e). 0: it has none. */
CLOTHI_UNUSED static int clothi_ccd_turn(const clothi_ccd *q, const double *r, int side,
                                         const double *n, double *W) {
    double e[2][3], to[2], c[2][3], normal[3], size;
    int    i, k;
    for (i = 0; i < (side < 0 ? 2 : 1); i++) {
        const int a = side < 0 ? 0 : 3 * side, last = 3 * (q->n - 1);
        const int b = side < 0 ? (i ? last : 3) : a < last ? a + 3 : 0;
        clothi_sub3(r + b, r + a, e[i]);
        for (to[i] = 0, k = 0; k < 3; k++)
            to[i] += n[k] * (e[i][k] - (q->r1[b + k] - q->r1[a + k]));
    }
    if (side < 0) {
        clothi_cross3(e[0], e[1], normal);
        clothi_cross3(e[1], normal, c[0]);
        clothi_cross3(normal, e[0], c[1]);
        size = clothi_dot3(normal, normal);
        for (k = 0; k < 3; k++) W[k] = (to[0] * c[0][k] + to[1] * c[1][k]) / size;
    } else {
        size = clothi_dot3(e[0], e[0]);
        for (k = 0; k < 3; k++) W[k] = to[0] * e[0][k] / size;
    }
    return size > 0;
}

/* Longest certified time from t with a direction that turns with the polygon, n + x W for x from
 * 0 to 1 between t and the end. A corner's distance is quadratic in x; |n + x W| is at most
 * 1 + x^2 W^2/2, as W is at right angles to n but for rounding. Up to x = 1 the hull is too wide,
 * so the first answer bounds the range for the next. */
CLOTHI_UNUSED static double clothi_ccd_turning(const clothi_ccd *q, const double *r, int side,
                                               const double *n, double t) {
    double W[3], a[4], b[4], c[4], ww, size, best = 0, h = 1;
    int    i, round;
    if (!clothi_ccd_turn(q, r, side, n, W)) return t;
    ww = clothi_dot3(W, W);
    size = fabs(W[0]) + fabs(W[1]) + fabs(W[2]);
    for (i = 0; i < q->n; i++) {
        const double wa = clothi_dot3(W, r + 3 * i);
        a[i] = clothi_dot3(n, r + 3 * i);
        b[i] = clothi_dot3(n, q->r1 + 3 * i) - a[i] + wa;
        c[i] = clothi_dot3(W, q->r1 + 3 * i) - wa;
    }
    for (round = 0; round < 3; round++) {
        const double floor = (q->s + 4 * q->E) * (1 + h * fabs(clothi_dot3(n, W)) + 1e-15) +
                             (4e-16 * q->s + 4 * q->E) * h * size;
        double       first = 2;
        for (i = 0; i < q->n; i++) {
            double f[3];
            f[0] = a[i] - floor;
            f[1] = a[i] + 0.5 * h * b[i] - floor;
            f[2] = a[i] + h * (b[i] + h * c[i]) - floor * (1 + 0.5 * (h * h * ww));
            if (!(f[0] > 0)) break;
            first = clothi_min(first, clothi_bernstein_first(f, 2));
        }
        if (i == q->n && first > 1 && h >= 1) return 2;
        if (i == q->n) best = clothi_max(best, h * clothi_min(first, 1));
        h = clothi_min(1, i == q->n ? 4 * best : 1e-3 * h);
    }
    return t + (1 - t) * best;
}

/* Longest certified time from t with the polygon's own plane, as clothi_ccd_axis. */
CLOTHI_UNUSED static double clothi_ccd_plane(clothi_ccd *q, double t) {
    double f[4], sign;
    int    i, round;
    if (!q->has_cubic) clothi_ccd_cubic(q);
    memcpy(f, q->c, sizeof f);
    clothi_bernstein_right(f, t);
    sign = f[0] < 0 ? -1 : 1;
    for (round = 0; round < 6; round++) {
        double x, h;
        for (i = 0; i < 4; i++)
            f[i] = sign * q->c[i] - q->s * (1 + 1e-14) * q->N[i] - q->E_c;
        clothi_bernstein_right(f, t);
        if (!(f[0] > 0)) return t;
        x = clothi_bernstein_first(f, 3);
        if (x > 1) return 2;
        h = clothi_min(1, 4 * x);           /* a narrower hull                                  */
        clothi_bernstein_left(f, h);
        x = clothi_max(x, h * clothi_min(1, clothi_bernstein_first(f, 3))) * (1 - t);
        t = t + x;
        if (x < 1e-13) break;
    }
    return t;
}

/* Direction out [3], |out| = 1, to the nearest point v of the polygon r on its side, -1 its
 * inside; 0 when there is none. */
CLOTHI_UNUSED static int clothi_ccd_direction(const double *r, int n, int side, const double *v,
                                              double *out) {
    double e1[3], e2[3], len;
    int    k;
    clothi_sub3(r + 3, r, e1);
    clothi_sub3(r + 3 * (n - 1), r, e2);
    if (side < 0) clothi_cross3(e1, e2, out);
    else {
        const double *a = r + 3 * side, *b = r + 3 * (side + 1 < n ? side + 1 : 0);
        double        ee, ve;
        clothi_sub3(b, a, e1);
        ee = clothi_dot3(e1, e1);
        ve = clothi_dot3(v, e1);
        memcpy(out, v, 3 * sizeof *v);
        if (ve * ve < 1e-8 * ee * clothi_dot3(v, v))    /* at right angles, but for rounding */
            for (k = 0; k < 3; k++) out[k] -= ve / ee * e1[k];
    }
    len = sqrt(clothi_dot3(out, out));
    if (!(len > 1e-120)) {                  /* squares underflow                                */
        const double m = clothi_max(fabs(out[0]), clothi_max(fabs(out[1]), fabs(out[2])));
        const double scale = m > 0 ? clothi_unit_scale(m) : 0;
        for (k = 0; k < 3; k++) out[k] *= scale;
        len = sqrt(clothi_dot3(out, out));
        if (!(len > 0.1)) return 0;
    }
    if (side < 0 && clothi_dot3(out, r) < 0) len = -len;
    for (k = 0; k < 3; k++) out[k] /= len;
    return 1;
}

/* The whole search in doubles, m in range. */
CLOTHI_UNUSED static int clothi_ccd_run(clothi_ccd *q, double *toi) {
    const double near = q->s * (1 + CLOTHI_CCD_NEAR) + 4 * q->E;
    double       t = 0;
    int          step, i;
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        double r[12], lambda[4], v[3], n[3], next = t, d;
        int    side, turned;
        for (i = 0; i < 3 * q->n; i++) r[i] = (1 - t) * q->r0[i] + t * q->r1[i];
        side = clothi_nearest(r, q->n, lambda, v);
        d = sqrt(clothi_dot3(v, v));
        turned = clothi_ccd_direction(r, q->n, side, v, n);
        if (turned) next = clothi_ccd_axis(q, n, t);
        if (next > 1) return 0;
        next = clothi_max(next, clothi_ccd_plane(q, t));
        if (next > 1) return 0;
        if (turned)
            next = clothi_max(next, clothi_ccd_turning(q, r, side, n, t));
        if (next > 1) return 0;
        if (!(next > t) && side >= 0 && clothi_ccd_direction(r, q->n, -1, v, n))
            next = clothi_ccd_axis(q, n, t);
        if (next > 1) return 0;
        if (!(next > t) || (d <= near && next - t < CLOTHI_CCD_NEAR)) {
            t = next;
            break;
        }
        t = next;
    }
    *toi = t;
    return 1;
}

/* ---- twice the digits: for min_sep = 0, where the search above ends in its own rounding. The
 * same two advances in numbers h + l of 106 bits, from the time reached so far. A sum is good to
 * 3 u^2, a product to 7 u^2 [Joldes, Muller, Popescu 2017, Tight and rigorous error bounds for
 * basic building blocks of double-word arithmetic, ACM TOMS 44, doi 10.1145/3121432]: 8 times the
 * counts above with u^2 for u, kept four times over. Steps are fractions of what is left of
 * [0,1], so that doubles do for them. */

typedef struct clothi_dd {
    double h, l;
} clothi_dd;

CLOTHI_UNUSED static clothi_dd clothi_dd_of(double h, double l) {
    clothi_dd c;
    clothi_two_sum(h, l, &c.h, &c.l);
    return c;
}

CLOTHI_UNUSED static clothi_dd clothi_dd_add(clothi_dd a, clothi_dd b) {
    double s, r, v, w;
    clothi_two_sum(a.h, b.h, &s, &r);
    clothi_two_sum(a.l, b.l, &v, &w);
    a = clothi_dd_of(s, r + v);
    return clothi_dd_of(a.h, w + a.l);
}

CLOTHI_UNUSED static clothi_dd clothi_dd_neg(clothi_dd a) {
    a.h = -a.h;
    a.l = -a.l;
    return a;
}

CLOTHI_UNUSED static clothi_dd clothi_dd_mul(clothi_dd a, clothi_dd b) {
    double p, r;
    clothi_two_product(a.h, b.h, &p, &r);
    return clothi_dd_of(p, r + (a.h * b.l + a.l * b.h));
}

CLOTHI_UNUSED static clothi_dd clothi_dd_dot(const clothi_dd *a, const clothi_dd *b) {
    return clothi_dd_add(clothi_dd_add(clothi_dd_mul(a[0], b[0]), clothi_dd_mul(a[1], b[1])),
                         clothi_dd_mul(a[2], b[2]));
}

CLOTHI_UNUSED static void clothi_dd_cross(const clothi_dd *a, const clothi_dd *b,
                                          clothi_dd *out) {
    int k;
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = clothi_dd_add(clothi_dd_mul(a[i], b[j]),
                               clothi_dd_neg(clothi_dd_mul(a[j], b[i])));
    }
}

/* out [n] = a + t (b - a) */
CLOTHI_UNUSED static void clothi_dd_mix(const clothi_dd *a, const clothi_dd *b, clothi_dd t,
                                        int n, clothi_dd *out) {
    const clothi_dd s = clothi_dd_add(clothi_dd_of(1, 0), clothi_dd_neg(t));
    int             k;
    for (k = 0; k < n; k++)
        out[k] = clothi_dd_add(clothi_dd_mul(s, a[k]), clothi_dd_mul(t, b[k]));
}

CLOTHI_UNUSED static void clothi_dd_sub(const clothi_dd *a, const clothi_dd *b, clothi_dd *out) {
    int k;
    for (k = 0; k < 3; k++) out[k] = clothi_dd_add(a[k], clothi_dd_neg(b[k]));
}

/* The foot p [3] of the perpendicular on the side from a to b, or the nearer end. */
CLOTHI_UNUSED static void clothi_dd_foot(const clothi_dd *a, const clothi_dd *b, clothi_dd *p) {
    clothi_dd e[3], ee, ae, rest;
    int       k, pass;
    clothi_dd_sub(b, a, e);
    ee = clothi_dd_dot(e, e);
    ae = clothi_dd_neg(clothi_dd_dot(a, e));
    rest = clothi_dd_add(ee, clothi_dd_neg(ae));
    memcpy(p, rest.h > 0 ? a : b, 3 * sizeof *p);
    if (!(ae.h > 0) || !(rest.h > 0)) return;
    for (pass = 0; pass < 3; pass++) {      /* each pass adds 52 bits */
        const clothi_dd dt = clothi_dd_of(-clothi_dd_dot(p, e).h / ee.h, 0);
        for (k = 0; k < 3; k++) p[k] = clothi_dd_add(p[k], clothi_dd_mul(dt, e[k]));
    }
}

/* Direction n [3] to the nearest point of the polygon r; returns the distance, 0: no direction. */
CLOTHI_UNUSED static double clothi_dd_direction(const clothi_dd *r, int n, clothi_dd *out) {
    clothi_dd e1[3], e2[3], normal[3], c[3], nn, s, t, g;
    double    best = HUGE_VAL, d, len;
    int       i;
    clothi_dd_sub(r + 3, r, e1);
    clothi_dd_sub(r + 3 * (n - 1), r, e2);
    clothi_dd_cross(e1, e2, normal);
    nn = clothi_dd_dot(normal, normal);
    clothi_dd_cross(e2, r, c);
    s = clothi_dd_dot(c, normal);
    clothi_dd_cross(r, e1, c);
    t = clothi_dd_dot(c, normal);
    g = clothi_dd_add(nn, clothi_dd_neg(n == 3 ? clothi_dd_add(s, t) : s.h > t.h ? s : t));
    if (nn.h > 0 && s.h >= 0 && t.h >= 0 && g.h >= 0) {
        g = clothi_dd_dot(normal, r);
        len = sqrt(nn.h) * (g.h < 0 ? -1 : 1);
        d = g.h / len;
        memcpy(out, normal, 3 * sizeof *out);
    } else {
        for (i = 0; i < n; i++) {
            clothi_dd p[3];
            clothi_dd_foot(r + 3 * i, r + 3 * (i + 1 < n ? i + 1 : 0), p);
            d = clothi_dd_dot(p, p).h;
            if (d < best) {
                best = d;
                memcpy(out, p, sizeof p);
            }
        }
        d = len = sqrt(best);
    }
    if (!(fabs(len) > 1e-150)) return 0;
    for (i = 0; i < 3; i++) out[i] = clothi_dd_mul(out[i], clothi_dd_of(1 / len, 0));
    return d;
}

/* Certified fraction of [t,1] with the direction n; 2: all of it. */
CLOTHI_UNUSED static double clothi_dd_axis(const clothi_dd *r0, const clothi_dd *r1, int corners,
                                           const clothi_dd *n, clothi_dd t, double floor) {
    double until = 2;
    int    k;
    for (k = 0; k < corners; k++) {
        clothi_dd h0 = clothi_dd_dot(n, r0 + 3 * k), h1 = clothi_dd_dot(n, r1 + 3 * k), g;
        clothi_dd_mix(&h0, &h1, t, 1, &g);
        if (!(g.h > 2 * floor)) return 0;
        if (!(h1.h > floor)) until = clothi_min(until, (g.h - floor) / (g.h - h1.h));
    }
    return until > 1 ? 2 : until * (1 - 1e-15);
}

/* The same with the polygon's own plane; c [4] Bernstein on [0,1], good to E. */
CLOTHI_UNUSED static double clothi_dd_plane(const clothi_dd *c, clothi_dd t, double E) {
    clothi_dd f[4];
    double    g[4], x;
    int       i, k;
    memcpy(f, c, sizeof f);
    for (k = 3; k > 0; k--) clothi_dd_mix(f, f + 1, t, k, f);
    for (i = 0; i < 4; i++) g[i] = (f[0].h < 0 ? -f[i].h : f[i].h) - E;
    if (!(g[0] > E)) return 0;
    x = clothi_bernstein_first(g, 3);
    return x > 1 ? 2 : x * (1 - 1e-15);
}

CLOTHI_UNUSED static void clothi_dd_cubic(const clothi_dd *r0, const clothi_dd *r1, int n,
                                          clothi_dd *c) {
    const clothi_dd third = clothi_dd_of(1.0 / 3, 1.850371707708594e-17);
    clothi_dd       a[2][3], b[2][3], m[4][3];
    int             i;
    for (i = 0; i < 2; i++) {
        const clothi_dd *r = i ? r1 : r0;
        clothi_dd_sub(r + 3, r, a[i]);
        clothi_dd_sub(r + 3 * (n - 1), r, b[i]);
    }
    clothi_dd_cross(a[0], b[0], m[0]);
    clothi_dd_cross(a[0], b[1], m[1]);
    clothi_dd_cross(a[1], b[0], m[2]);
    clothi_dd_cross(a[1], b[1], m[3]);
    for (i = 0; i < 3; i++) m[1][i] = clothi_dd_add(m[1][i], m[2][i]);
    c[0] = clothi_dd_dot(m[0], r0);
    c[1] = clothi_dd_add(clothi_dd_dot(m[0], r1), clothi_dd_dot(m[1], r0));
    c[2] = clothi_dd_add(clothi_dd_dot(m[3], r0), clothi_dd_dot(m[1], r1));
    c[3] = clothi_dd_dot(m[3], r1);
    c[1] = clothi_dd_mul(c[1], third);
    c[2] = clothi_dd_mul(c[2], third);
}

/* From *toi on for min_sep = 0: 0 when the rest of the motion is free, else 1 and the time. */
CLOTHI_UNUSED static int clothi_dd_run(int n, const clothi_dd *r0, const clothi_dd *r1, double m,
                                       double e, double *toi) {
    const double E = 1.262177448353619e-29 * m;                    /* 2^-96 */
    const double E_c = e > 1e-60 ? 2.019483917365790e-28 * m * e * e : HUGE_VAL;
    clothi_dd    c[4], t = clothi_dd_of(*toi, 0), x[2];
    int          step;
    clothi_dd_cubic(r0, r1, n, c);
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        clothi_dd    r[12], dir[3];
        double       next;
        clothi_dd_mix(r0, r1, t, 3 * n, r);
        next = clothi_dd_direction(r, n, dir) > 0 ? clothi_dd_axis(r0, r1, n, dir, t, E) : 0;
        if (next < 2) next = clothi_max(next, clothi_dd_plane(c, t, E_c));
        if (next > 1) return 0;
        if (!(next > 1e-31)) break;
        x[0] = clothi_dd_of(1, 0);
        clothi_dd_mix(&t, x, clothi_dd_of(next, 0), 1, x + 1);
        t = x[1];
    }
    *toi = clothi_max(*toi, clothi_min(1, t.h * (1 - 4.5e-16)));
    return 1;
}

/* Differences of the pair x [4x3] times a power of two, without error. */
CLOTHI_UNUSED static void clothi_dd_polygon(int edge_edge, const double *x, double scale,
                                            clothi_dd *r) {
    static const unsigned char of[2][8] = {{0, 1, 0, 2, 0, 3, 0, 3}, {0, 2, 1, 2, 1, 3, 0, 3}};
    int                        i, k;
    for (i = 0; i < 4; i++)
        for (k = 0; k < 3; k++) {
            const double a = x[3 * of[edge_edge][2 * i] + k];
            const double b = x[3 * of[edge_edge][2 * i + 1] + k];
            clothi_dd    c = clothi_dd_of(a, -b);
            c.h *= scale;
            c.l *= scale;
            r[3 * i + k] = c;
        }
}

/* A contact beyond doubt, which needs no more digits: around t the plane passes through the
 * origin, which is well inside of the polygon. */
CLOTHI_UNUSED static int clothi_ccd_plain(const clothi_ccd *q, double t) {
    const double dt = CLOTHI_CCD_NEAR;
    double       r[12], lambda[4], v[3], before[4], after[4];
    int          i;
    if (t < dt || t > 1 - dt) return 0;
    for (i = 0; i < 3 * q->n; i++) r[i] = (1 - t) * q->r0[i] + t * q->r1[i];
    if (clothi_nearest(r, q->n, lambda, v) >= 0) return 0;
    for (i = 0; i < q->n; i++)
        if (!(lambda[i] > 1e-4)) return 0;
    memcpy(before, q->c, sizeof before);
    memcpy(after, q->c, sizeof after);
    clothi_bernstein_right(before, t - dt);
    clothi_bernstein_right(after, t + dt);
    return (before[0] > q->E_c && after[0] < -q->E_c) ||
           (before[0] < -q->E_c && after[0] > q->E_c);
}

/* One of the three axes keeps the polygon away all the time. */
CLOTHI_UNUSED static int clothi_ccd_boxes(const clothi_ccd *q) {
    int i, k;
    for (k = 0; k < 3; k++) {
        double lo = clothi_min(q->r0[k], q->r1[k]), hi = clothi_max(q->r0[k], q->r1[k]);
        for (i = k + 3; i < 3 * q->n; i += 3) {
            lo = clothi_min(lo, clothi_min(q->r0[i], q->r1[i]));
            hi = clothi_max(hi, clothi_max(q->r0[i], q->r1[i]));
        }
        if (lo > q->floor || -hi > q->floor) return 1;
    }
    return 0;
}

/* The differences, their size and the bounds; 0 when the largest is 0 or too large. */
CLOTHI_UNUSED static int clothi_ccd_load(clothi_ccd *q, int edge_edge, const double *xa,
                                         const double *xb, double min_sep) {
    int i;
    q->n = clothi_pair_polygon(edge_edge, xa, q->r0);
    clothi_pair_polygon(edge_edge, xb, q->r1);
    q->s = min_sep > 0 ? min_sep : 0;
    q->scale = 1;
    q->has_cubic = 0;
    for (q->m = 0, i = 0; i < 3 * q->n; i++)
        q->m = clothi_max(q->m, clothi_max(fabs(q->r0[i]), fabs(q->r1[i])));
    if (!(q->m > 0 && q->m < 1e307)) return 0;
    if (!(q->m > 1e-30 && q->m < 1e30)) {
        q->scale = clothi_unit_scale(q->m);
        q->m *= q->scale;
        q->s *= q->scale;
        for (i = 0; i < 3 * q->n; i++) {
            q->r0[i] *= q->scale;
            q->r1[i] *= q->scale;
        }
    }
    q->E = 1.7763568394002505e-15 * q->m;   /* 2^-49 */
    q->floor = q->s * (1 + 1e-15) + 2 * q->E;
    return 1;
}

CLOTHI_UNUSED static int clothi_ccd_pair(int edge_edge, const double *xa, const double *xb,
                                         double min_sep, double *toi) {
    clothi_ccd q;
    *toi = 0;
    if (clothi_find_nonfinite(xa, 12) >= 0 || clothi_find_nonfinite(xb, 12) >= 0 ||
        !clothi_finite(min_sep))
        return 1;
    if (!clothi_ccd_load(&q, edge_edge, xa, xb, min_sep)) {
        double small[24];
        int    i;
        if (q.m <= 0) return 1;
        for (i = 0; i < 24; i++)            /* a difference may be beyond the doubles           */
            small[i] = (1.0 / 256) * (i < 12 ? xa[i] : xb[i - 12]);
        return clothi_ccd_pair(edge_edge, small, small + 12, (1.0 / 256) * min_sep, toi);
    }
    if (!(q.s < 4 * q.m)) return 1;         /* all of it is within min_sep                      */
    *toi = 1;
    if (clothi_ccd_boxes(&q) || !clothi_ccd_run(&q, toi)) return 0;
    if (q.s <= 0 && !clothi_ccd_plain(&q, *toi)) {
        clothi_dd r0[12], r1[12];
        clothi_dd_polygon(edge_edge, xa, q.scale, r0);
        clothi_dd_polygon(edge_edge, xb, q.scale, r1);
        return clothi_dd_run(q.n, r0, r1, q.m, q.e, toi);
    }
    return 1;
}

CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi) {
    double    when;
    const int hit = clothi_ccd_pair(0, xa, xb, min_sep, &when);
    if (toi) *toi = hit ? when : 1;
    return hit;
}

CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi) {
    double    when;
    const int hit = clothi_ccd_pair(1, xa, xb, min_sep, &when);
    if (toi) *toi = hit ? when : 1;
    return hit;
}

/* Weights w [4] (clothi_pair_weights) and unit normal n [3] of a contact found at toi, such that
 * g = n.sum w_i x_i at xa, which is returned, is positive: the side held at the start. n is the
 * direction of the distance at toi; where that is lost in rounding, the normal of the face or of
 * both edges; where that has no side at the start, the direction of the distance at the start.
 * 0 is returned when the two touch at the start; n is then one of these, or the x axis. */
CLOTHI_UNUSED static double clothi_contact_frame(int edge_edge, const double *xa,
                                                 const double *xb, double toi, double *w,
                                                 double *n) {
    double    r0[12], r[12], lambda[4], start[3] = {0, 0, 0}, v[3], m = 0, m0 = 0, scale, g = 0;
    const int corners = clothi_pair_polygon(edge_edge, xa, r0);
    int       i, k, way;
    clothi_pair_polygon(edge_edge, xb, r);
    for (i = 0; i < 3 * corners; i++) {
        m0 = clothi_max(m0, fabs(r0[i]));
        m = clothi_max(m, fabs(r[i]));
    }
    scale = m > 0 || m0 > 0 ? clothi_unit_scale(clothi_max(m, m0)) : 1;
    for (i = 0; i < 3 * corners; i++)
        r[i] = (1 - toi) * (r0[i] * scale) + toi * (r[i] * scale);
    scale = m0 > 0 ? clothi_unit_scale(m0) : 1;
    for (i = 0; i < 3 * corners; i++) r0[i] *= scale;
    way = clothi_nearest(r, corners, lambda, v);
    clothi_pair_weights(edge_edge, lambda, w);
    for (i = 0; i < corners; i++)
        for (k = 0; k < 3; k++) start[k] += lambda[i] * r0[3 * i + k];
    for (i = 0; i < 3; i++) {
        int found;
        if (i == 0) found = clothi_dot3(v, v) > 1e-22 &&
                            clothi_ccd_direction(r, corners, way, v, n);
        else if (i == 1) found = clothi_ccd_direction(r, corners, -1, v, n);
        else {
            way = clothi_nearest(r0, corners, lambda, v);
            found = clothi_ccd_direction(r0, corners, way, v, n);
        }
        if (!found) continue;
        g = clothi_dot3(n, start);
        if (i == 1 && g < 0) {
            for (k = 0; k < 3; k++) n[k] = -n[k];
            g = -g;
        }
        if (g > (i < 2 ? 1e-12 : 0)) return g / scale;
    }
    if (!(fabs(clothi_dot3(n, n) - 1) < 1e-9)) {
        n[0] = 1;
        n[1] = n[2] = 0;
    }
    return 0;
}

/* ===== [5.1] HIERARCHY ======================================================================= */

/* ===== [5.2] TRIANGLES THAT INTERSECT ======================================================== */

/* ===== [6.1] QUADRATIC PROGRAM =============================================================== */

/* ===== [7.1] DISTANCE GRID =================================================================== */

/* ===== [7.2] OBSTACLES THAT PENETRATE THEMSELVES ============================================= */

/* ===== [8.1] SCENE =========================================================================== */

/* ===== [8.2] PROXIMITY AND FRICTION ========================================================== */

/* ===== [8.3] IMPACT ZONES ==================================================================== */

/* ===== [8.4] THE CONTACT IN THE STEP ========================================================= */

/* ===== [8.5] QUERIES ========================================================================= */

/* ===== [9.1] CHANGES =========================================================================
 *
 * 0.1.0  first version. MIT licence: the text in LICENSE holds for this file.
 */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
