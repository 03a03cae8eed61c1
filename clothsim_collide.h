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
 *   - At every time before *toi the distance is greater than min_sep. *toi is early by the time in
 *     which the distance falls from min_sep + max(1e-6 min_sep, 1e-14 size) to min_sep.
 *   - Within min_sep at the start: 1 and 0, also when the two part.
 *   - 1 may be a false alarm when the distance stays below min_sep + the same amount.
 * A number that is not finite: 1 and 0. Cost: 0.1 to 0.3 us without contact, about 1 us with. */
CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi);
CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi);

/* ===== [2.2] QUADRATIC PROGRAM =============================================================== */

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* Which faces of a mesh intersect each other at given positions, decided exactly.          [5.2]
 * Two faces intersect when, as closed triangles, they have a point in common that is not on a
 * vertex or an edge that both name: touching counts, neighbours along an edge count only when
 * folded onto each other in one plane, faces with the same three vertices never. Vertices at one
 * place with two numbers are two: a mesh that is not welded touches itself all along its seams.
 * in   x          [nv x 3] m, finite
 * in   faces      [nf x 3], no corner twice; any set of triangles, also without area
 * in   max_pairs  that pairs has room for; 0 with pairs NULL: count only
 * out  pairs      [max_pairs x 2] faces i < j in increasing order: the first min(*count, max_pairs)
 * out  count      how many there are in all, may be NULL; 0 on failure
 * returns CLOTH_OK; CLOTH_ERR_ARGUMENT; CLOTH_ERR_MESH: an index out of range or a corner twice;
 *   CLOTH_ERR_NONFINITE; CLOTH_ERR_MEMORY; CLOTH_ERR_CAPACITY: more than 2^30 pairs. pairs is as
 *   before on failure.
 * contract: alloc scratch | cost O(nf log nf + pairs near each other), 2 us a face | uses the
 *   parallel hook | same answer for any worker count */
CLOTH_API cloth_status cloth_intersections(const cloth_hooks *hooks, int nv, const double *x,
                                           int nf, const int *faces, int max_pairs, int *pairs,
                                           int *count);

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
 *     c(t) = det(e1, e2, r_0)   the polygon's own plane, e1 and e2 its sides: a cubic.
 *                               |c| > s |e1 x e2| as long as the plane misses the ball.
 *
 * The first needs no inside test, also holds for polygons of no area, and passes beside a polygon;
 * the second bridges slow approach to the plane. c and the bound |e1 x e2| <= sum B_i |n_i| are in
 * Bernstein form on [t,1]: the first point of the axis that their convex hull reaches is a safe
 * time. Both advance from t; the further one counts. Contact is what neither can exclude.
 *
 * Rounding. u = 2^-53, m = the largest |difference|. A corner of r(t) is off by at most 4 u m per
 * axis, a product n.r with |n| = 1 by 13 u m in all: E = 16 u m is kept between s and what counts
 * as free, and twice as much where a root of the linear function is taken. The coefficients of c
 * are off by at most 64 u m e^2, e the largest |side|, splitting by 54 u m e^2, the root by
 * 72 u m e^2: 256 u m e^2 is kept. m is brought to about 1 by a power of two when it is beyond
 * 1e-60 .. 1e60.
 *
 * checked: tests/test_ccd.c, tests/fuzz_ccd.c */

#define CLOTHI_CCD_STEPS 256                /* then contact: grazes by less than it can tell    */
#define CLOTHI_CCD_NEAR  (1.0 / 1048576)    /* contact: within s (1 + this)                     */

typedef struct clothi_ccd {
    int    n;                               /* corners                                          */
    double r0[12], r1[12];                  /* [n x 3] at t = 0 and 1                           */
    double s, m, E;
    double floor;                           /* n.r above this is certainly above s              */
    int    has_cubic;
    double c[4], N[4];                      /* Bernstein on [0,1]: cubic, bound of its normal   */
    double E_c;
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
    q->E_c = 2.842170943040401e-14 * q->m * e * e;      /* 2^-45 */
    q->has_cubic = 1;
}

/* f [4] on [0,1] becomes f on [t,1]. */
CLOTHI_UNUSED static void clothi_bernstein_right(double *f, double t) {
    int i, k;
    for (k = 3; k > 0; k--)
        for (i = 0; i < k; i++) f[i] = (1 - t) * f[i] + t * f[i + 1];
}

/* Where the hull of f [4] on [0,1], f[0] > 0, first meets 0; 2 when it does not. */
CLOTHI_UNUSED static double clothi_bernstein_first(const double *f) {
    double first = 2;
    int    i, k;
    for (i = 1; i < 4; i++)
        for (k = 0; !(f[i] > 0) && k < i; k++)
            if (f[k] > 0)
                first = clothi_min(first, (k + (i - k) * (f[k] / (f[k] - f[i]))) / 3);
    return first;
}

/* Longest certified time from t with the polygon's own plane, as clothi_ccd_axis. */
CLOTHI_UNUSED static double clothi_ccd_plane(clothi_ccd *q, double t) {
    double f[4], sign;
    int    i, round;
    if (!q->has_cubic) clothi_ccd_cubic(q);
    memcpy(f, q->c, sizeof f);
    clothi_bernstein_right(f, t);
    sign = f[0] < 0 ? -1 : 1;
    for (round = 0; round < 8; round++) {
        double x;
        for (i = 0; i < 4; i++)
            f[i] = sign * q->c[i] - q->s * (1 + 1e-14) * q->N[i] - q->E_c;
        clothi_bernstein_right(f, t);
        if (!(f[0] > 0)) return t;
        x = clothi_bernstein_first(f);
        if (x > 1) return 2;
        x *= 1 - t;
        t = t + x;
        if (x < 1e-3 * t) break;
    }
    return t;
}

/* Direction n [3], |n| = 1, to the nearest point v of the polygon r on its side, -1 its inside. */
CLOTHI_UNUSED static int clothi_ccd_direction(const double *r, int n, int side, const double *v,
                                                double *out) {
    double e1[3], e2[3], len;
    int    k;
    clothi_sub3(r + 3, r, e1);
    clothi_sub3(r + 3 * (n - 1), r, e2);
    if (side < 0) {
        clothi_cross3(e1, e2, out);
        len = sqrt(clothi_dot3(out, out));
        if (clothi_dot3(out, r) < 0) len = -len;
    } else {
        const double *a = r + 3 * side, *b = r + 3 * (side + 1 < n ? side + 1 : 0);
        double        ee, ve;
        clothi_sub3(b, a, e1);
        ee = clothi_dot3(e1, e1);
        ve = clothi_dot3(v, e1);
        memcpy(out, v, 3 * sizeof *v);
        if (ve * ve < 1e-8 * ee * clothi_dot3(v, v))    /* at right angles, but for rounding */
            for (k = 0; k < 3; k++) out[k] -= ve / ee * e1[k];
        len = sqrt(clothi_dot3(out, out));
    }
    if (!(fabs(len) > 0)) return 0;
    for (k = 0; k < 3; k++) out[k] /= len;
    return 1;
}

/* The whole search, m in range. */
CLOTHI_UNUSED static int clothi_ccd_run(clothi_ccd *q, double *toi) {
    const double near = q->s * (1 + CLOTHI_CCD_NEAR) + 4 * q->E;
    double       t = 0;
    int          step, i;
    for (step = 0; step < CLOTHI_CCD_STEPS; step++) {
        double r[12], lambda[4], v[3], n[3], next = t, d;
        int    side;
        for (i = 0; i < 3 * q->n; i++) r[i] = (1 - t) * q->r0[i] + t * q->r1[i];
        side = clothi_nearest(r, q->n, lambda, v);
        d = sqrt(clothi_dot3(v, v));
        if (clothi_ccd_direction(r, q->n, side, v, n)) next = clothi_ccd_axis(q, n, t);
        if (next > 1) return 0;
        next = clothi_max(next, clothi_ccd_plane(q, t));
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

CLOTHI_UNUSED static int clothi_ccd_pair(int edge_edge, const double *xa, const double *xb,
                                           double min_sep, double *toi) {
    clothi_ccd q;
    double       when = 1, scale = 1;
    int          i, hit;
    if (clothi_find_nonfinite(xa, 12) >= 0 || clothi_find_nonfinite(xb, 12) >= 0 ||
        !clothi_finite(min_sep)) {
        if (toi) *toi = 0;
        return 1;
    }
    q.n = clothi_pair_polygon(edge_edge, xa, q.r0);
    clothi_pair_polygon(edge_edge, xb, q.r1);
    q.s = min_sep > 0 ? min_sep : 0;
    q.has_cubic = 0;
    for (q.m = 0, i = 0; i < 3 * q.n; i++)
        q.m = clothi_max(q.m, clothi_max(fabs(q.r0[i]), fabs(q.r1[i])));
    if (!(q.m > 1e-60 && q.m < 1e60)) {
        double half[24];
        if (q.m <= 0) {
            if (toi) *toi = 0;
            return 1;
        }
        if (q.m > 1e307) {                  /* a difference may be beyond the doubles */
            for (i = 0; i < 24; i++) half[i] = ldexp(i < 12 ? xa[i] : xb[i - 12], -8);
            return clothi_ccd_pair(edge_edge, half, half + 12, ldexp(min_sep, -8), toi);
        }
        scale = clothi_unit_scale(q.m);
        q.m *= scale;
        q.s *= scale;
        for (i = 0; i < 3 * q.n; i++) q.r0[i] *= scale, q.r1[i] *= scale;
    }
    q.E = 1.7763568394002505e-15 * q.m;     /* 2^-49 */
    q.floor = q.s * (1 + 1e-15) + 2 * q.E;
    hit = !(q.s < 4 * q.m) || (!clothi_ccd_boxes(&q) && clothi_ccd_run(&q, &when));
    if (!(q.s < 4 * q.m)) when = 0;
    if (toi) *toi = when;
    return hit;
}

CLOTH_API int cloth_ccd_vf(const double *xa, const double *xb, double min_sep, double *toi) {
    return clothi_ccd_pair(0, xa, xb, min_sep, toi);
}

CLOTH_API int cloth_ccd_ee(const double *xa, const double *xb, double min_sep, double *toi) {
    return clothi_ccd_pair(1, xa, xb, min_sep, toi);
}

/* Weights w [4] (clothi_pair_weights) and unit normal n [3] of a contact found at toi, such that
 * g = n.sum w_i x_i at xa, which is returned, is positive: the side held at the start. n is the
 * direction of the distance at toi; where that is lost in rounding, the normal of the face or of
 * both edges; where that has no side at the start, the direction of the distance at the start.
 * 0 is returned when the two touch at the start; n is then one of these, or the x axis. */
CLOTHI_UNUSED static double clothi_contact_frame(int edge_edge, const double *xa,
                                                 const double *xb, double toi, double *w,
                                                 double *n) {
    double    r0[12], r[12], lambda[4], start[3] = {0, 0, 0}, v[3], m = 0, scale, g = 0;
    const int corners = clothi_pair_polygon(edge_edge, xa, r0);
    int       i, k, way;
    clothi_pair_polygon(edge_edge, xb, r);
    for (i = 0; i < 3 * corners; i++) m = clothi_max(m, clothi_max(fabs(r0[i]), fabs(r[i])));
    scale = m > 0 ? clothi_unit_scale(m) : 1;
    for (i = 0; i < 3 * corners; i++) {
        r0[i] *= scale;
        r[i] = (1 - toi) * r0[i] + toi * (r[i] * scale);
    }
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

/* ===== [5.1] HIERARCHY ========================================================================
 *
 *            1                 Boxes around boxes, as a complete binary tree in one array: the
 *         /     \              children of node i are 2i and 2i+1, its depth d is chosen so that
 *        2       3             the 2^d leaves hold at most CLOTHI_BVH_LEAF items each. With the
 *       / \     / \            items in leaf order, node j of level l holds the items
 *      4   5   6   7               [ floor(j n / 2^l), floor((j+1) n / 2^l) ):
 *     ...             items    no pointers, no counts, no recursion. n items, d < 29.
 *
 *   build     Each node is split at its median along the axis on which the centres of its boxes
 *             reach furthest. The items are sorted once along each axis; a split keeps the three
 *             orders by stable partition: O(n log n), whatever the boxes are.
 *   refit     Bottom-up in one sweep over the array; the splits stay. A mesh that deforms keeps
 *             its neighbours, so that the tree stays good.
 *   rounding  Nodes are floats rounded outward: r = fl(x) - d with d >= ulp(fl(x)) is, rounding
 *             being monotone, at most fl(x) - ulp < x. They only prune; an item pair is decided by
 *             the given doubles, touching counts as overlapping: the answer is that of brute
 *             force. NaN is unbounded: it overlaps everything.
 *   descent   Of two overlapping nodes the larger one is opened (the sum of a box's extents is kept
 *             in its fourth lane). A stack of pairs: opening one puts two on it and goes one level
 *             down, so at most (levels of A) + (levels of B) + 1 <= 57 wait; the self query opens
 *             (a, a) into three and goes two levels down: the same bound.
 *   order     The pairs of nodes at a fixed level are the tasks of a parallel loop. Each writes
 *             into its own segment of the list, sized by what it found last time; a task that
 *             needs more counts on, and when all are done the segments are laid out anew and the
 *             loop runs again. Hence no allocation beside the loop or in the steady state, and
 *             one order of pairs for any number of workers.
 *   features  A vertex belongs to many faces, and its collision with a face would be found once
 *             for each. One face owns each vertex and each edge, and only the owner reports it
 *             [CTM08]. Nothing is lost: a box around the owner is around what it owns.
 *
 * [CTM08] Curtis, Tamstorf, Manocha: Fast collision detection for deformable models using
 *         representative-triangles, I3D 2008.
 * checked: tests/test_tree.c */

#define CLOTHI_BVH_LEAF   4
#define CLOTHI_BVH_STACK  64
#define CLOTHI_BVH_TASKS  4                 /* level whose nodes are the tasks, pairwise       */

typedef struct clothi_box {
    float lo[4], hi[4];                     /* x y z; lo[3]: sum of the extents, hi[3]: 0      */
} clothi_box;

/* A tree over n boxes. memset to 0 before the first build. Item i is reported as first + i. */
typedef struct clothi_bvh {
    int         n, depth;
    int         first;                      /* 0 after build; the caller's to set              */
    int        *item;                       /* [n] items in leaf order                         */
    double     *exact;                      /* [n x 6] their boxes                             */
    clothi_box *bound;                      /* [n] the same, rounded outward                   */
    clothi_box *node;                       /* [2^(depth+1)] from 1                            */
} clothi_bvh;

/* A growing list of pairs. memset to 0 before the first use; the memory is kept from one query to
 * the next, so that its size is a high-water mark. */
typedef struct clothi_pairs {
    int     count;
    int    *pair;                           /* [count x 2]                                     */
    size_t  room;                           /* pairs that the memory holds                     */
    int     tasks;                          /* entries of the arrays below                     */
    size_t *start;                          /* [tasks + 1] segment of each task                */
    size_t *found;                          /* [tasks] pairs that it has, also beyond its room */
    int     grown;                          /* times that memory was asked for                 */
} clothi_pairs;

/* --- the list of pairs --- */

CLOTHI_UNUSED static void clothi_pairs_free(const cloth_hooks *hooks, clothi_pairs *p) {
    clothi_free(hooks, p->pair);
    clothi_free(hooks, p->start);
    memset(p, 0, sizeof *p);
}

/* Where a task writes. */
typedef struct clothi_segment {
    int   *pair;
    size_t room, found;
} clothi_segment;

static clothi_segment clothi_segment_open(const clothi_pairs *p, int task) {
    clothi_segment s;
    s.pair = p->pair + 2 * p->start[task];
    s.room = p->start[task + 1] - p->start[task];
    s.found = 0;
    return s;
}

static inline void clothi_segment_put(clothi_segment *s, int a, int b) {
    if (s->found < s->room) {
        s->pair[2 * s->found] = a;
        s->pair[2 * s->found + 1] = b;
    }
    s->found++;
}

/* Segments for more tasks; new ones get room for `least` pairs. */
static cloth_status clothi_pairs_tasks(const cloth_hooks *hooks, clothi_pairs *p, int tasks,
                                       size_t least) {
    const size_t n = (size_t)tasks + (size_t)tasks / 2u;
    size_t      *start, i;
    if (tasks <= p->tasks) return CLOTH_OK;
    start = (size_t *)clothi_alloc(hooks, 2 * n + 1u, sizeof *start);
    if (!start) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %i tasks", tasks);
    p->grown++;
    for (i = 0; i < n; i++)
        start[i + 1] = start[i] + (i < (size_t)p->tasks ? p->start[i + 1] - p->start[i] : least);
    clothi_free(hooks, p->start);
    p->start = start;
    p->found = start + n + 1u;
    p->tasks = (int)n;
    return CLOTH_OK;
}

/* Memory for all segments, what they hold is lost. */
static cloth_status clothi_pairs_lay(const cloth_hooks *hooks, clothi_pairs *p) {
    const size_t need = p->start[p->tasks];
    int         *pair;
    if (need <= p->room) return CLOTH_OK;
    pair = (int *)clothi_alloc(hooks, need, 2 * sizeof *pair);
    if (!pair) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %z pairs", need);
    p->grown++;
    clothi_free(hooks, p->pair);
    p->pair = pair;
    p->room = need;
    return CLOTH_OK;
}

/* 1 when every task had room; else gives room to those that had not. */
static int clothi_pairs_fit(clothi_pairs *p, int tasks) {
    size_t end = p->start[0];
    int    i, fit = 1;
    for (i = 0; i < p->tasks; i++) {
        size_t room = p->start[i + 1] - end;
        if (i < tasks && p->found[i] > room) {
            room = p->found[i] + p->found[i] / 4u + 16u;
            fit = 0;
        }
        end = p->start[i + 1];
        p->start[i + 1] = p->start[i] + room;
    }
    return fit;
}

/* The segments one behind the other. */
static cloth_status clothi_pairs_close(const cloth_hooks *hooks, clothi_pairs *p, int tasks) {
    size_t at = 0;
    int    i;
    for (i = 0; i < tasks; i++) {
        memmove(p->pair + 2 * at, p->pair + 2 * p->start[i], 2 * p->found[i] * sizeof(int));
        at += p->found[i];
    }
    if (at > (size_t)(0x7fffffff / 2))
        return clothi_fail(hooks, CLOTH_ERR_CAPACITY, "%z pairs are too many", at);
    p->count = (int)at;
    return CLOTH_OK;
}

/* Runs fn over `tasks` tasks, which fill the segments of nlists lists, until all have room.
 * least: first guess of a segment's room. On failure every list is empty. */
static cloth_status clothi_pairs_run(const cloth_hooks *hooks, clothi_pairs *const *list,
                                     int nlists, int tasks, size_t least, cloth_range_fn *fn,
                                     void *ctx) {
    cloth_status status = CLOTH_OK;
    int          k, fit = 0;
    for (k = 0; k < nlists; k++) list[k]->count = 0;
    if (tasks == 0) return CLOTH_OK;
    for (k = 0; k < nlists && status == CLOTH_OK; k++)
        status = clothi_pairs_tasks(hooks, list[k], tasks, least);
    while (!fit && status == CLOTH_OK) {
        for (k = 0; k < nlists && status == CLOTH_OK; k++)
            status = clothi_pairs_lay(hooks, list[k]);
        if (status != CLOTH_OK) break;
        clothi_for(hooks, tasks, 1, fn, ctx);
        for (fit = 1, k = 0; k < nlists; k++) fit &= clothi_pairs_fit(list[k], tasks);
    }
    for (k = 0; k < nlists && status == CLOTH_OK; k++)
        status = clothi_pairs_close(hooks, list[k], tasks);
    for (k = 0; k < nlists && status != CLOTH_OK; k++) list[k]->count = 0;
    return status;
}

/* --- boxes --- */

/* The box over x moving linearly from xa to xb, and `pad` on every side: [n x 6] min xyz, max xyz.
 * in   xa, xb  [n x 3] m; xb NULL: at rest
 * in   pad     m, >= 0. Points come within D of each other only if their boxes with pads p, q that
 *              add up to D (but for rounding) overlap: from a + p >= b - q follows, rounding being
 *              monotone, fl(a + p) >= fl(b - q) */
CLOTHI_UNUSED static void clothi_swept_boxes(int n, const double *xa, const double *xb,
                                             double pad, double *box) {
    int i, k;
    if (!xb) xb = xa;
    pad *= 1 + 1e-15;                       /* the rounding of the pads' own sum               */
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            const double a = xa[3 * i + k], b = xb[3 * i + k];
            box[6 * i + k] = (a < b ? a : b) - pad;
            box[6 * i + 3 + k] = (a < b ? b : a) + pad;
        }
}

static inline void clothi_box_join(const double *a, const double *b, double *out) {
    int k;
    for (k = 0; k < 3; k++) {
        out[k] = a[k] < b[k] ? a[k] : b[k];
        out[3 + k] = a[3 + k] > b[3 + k] ? a[3 + k] : b[3 + k];
    }
}

/* The boxes [nf x 6] of faces from those of their vertices, vertex_box [nv x 6]. */
CLOTHI_UNUSED static void clothi_face_boxes(int nf, const int *faces, const double *vertex_box,
                                            double *box) {
    int f;
    for (f = 0; f < nf; f++) {
        clothi_box_join(vertex_box + 6 * faces[3 * f], vertex_box + 6 * faces[3 * f + 1],
                        box + 6 * f);
        clothi_box_join(box + 6 * f, vertex_box + 6 * faces[3 * f + 2], box + 6 * f);
    }
}

/* [6] against [6], touching included; NaN overlaps. */
static inline int clothi_boxes_meet(const double *a, const double *b) {
    return !((a[0] > b[3]) | (b[0] > a[3]) | (a[1] > b[4]) | (b[1] > a[4]) | (a[2] > b[5]) |
             (b[2] > a[5]));
}

static inline int clothi_nodes_meet(const clothi_box *a, const clothi_box *b) {
#if defined(CLOTHI_AVX) || defined(CLOTHI_SSE2)
    const __m128 below = _mm_cmple_ps(_mm_loadu_ps(a->lo), _mm_loadu_ps(b->hi));
    const __m128 above = _mm_cmple_ps(_mm_loadu_ps(b->lo), _mm_loadu_ps(a->hi));
    return (_mm_movemask_ps(_mm_and_ps(below, above)) & 7) == 7;
#else
    return (a->lo[0] <= b->hi[0]) & (b->lo[0] <= a->hi[0]) & (a->lo[1] <= b->hi[1]) &
           (b->lo[1] <= a->hi[1]) & (a->lo[2] <= b->hi[2]) & (b->lo[2] <= a->hi[2]);
#endif
}

#define CLOTHI_BVH_FAR  3.4e38              /* within the range of floats                      */
#define CLOTHI_BVH_STEP 1.2e-7f             /* more than 2^-23                                 */
#define CLOTHI_BVH_TINY 1.2e-38f            /* a step below the normal floats                  */

/* Floats that are not above, not below a double. */
static inline float clothi_float_below(double x) {
    float r;
    if (!(x >= -CLOTHI_BVH_FAR)) return -HUGE_VALF;
    r = (float)(x < CLOTHI_BVH_FAR ? x : CLOTHI_BVH_FAR);
    return r - (fabsf(r) * CLOTHI_BVH_STEP + CLOTHI_BVH_TINY);
}

static inline float clothi_float_above(double x) {
    float r;
    if (!(x <= CLOTHI_BVH_FAR)) return HUGE_VALF;
    r = (float)(x > -CLOTHI_BVH_FAR ? x : -CLOTHI_BVH_FAR);
    return r + (fabsf(r) * CLOTHI_BVH_STEP + CLOTHI_BVH_TINY);
}

static void clothi_node_empty(clothi_box *b) {
    int k;
    for (k = 0; k < 4; k++) {
        b->lo[k] = HUGE_VALF;
        b->hi[k] = -HUGE_VALF;
    }
}

static inline void clothi_node_join(const clothi_box *a, const clothi_box *b, clothi_box *out) {
#if defined(CLOTHI_AVX) || defined(CLOTHI_SSE2)
    _mm_storeu_ps(out->lo, _mm_min_ps(_mm_loadu_ps(a->lo), _mm_loadu_ps(b->lo)));
    _mm_storeu_ps(out->hi, _mm_max_ps(_mm_loadu_ps(a->hi), _mm_loadu_ps(b->hi)));
#else
    int k;
    for (k = 0; k < 4; k++) {
        out->lo[k] = a->lo[k] < b->lo[k] ? a->lo[k] : b->lo[k];
        out->hi[k] = a->hi[k] > b->hi[k] ? a->hi[k] : b->hi[k];
    }
#endif
}

static inline void clothi_node_measure(clothi_box *b) {
    b->lo[3] = (b->hi[0] - b->lo[0]) + (b->hi[1] - b->lo[1]) + (b->hi[2] - b->lo[2]);
    b->hi[3] = 0;
}

/* A box [6] rounded outward. */
static inline void clothi_node_around(const double *box, clothi_box *out) {
    int k;
    for (k = 0; k < 3; k++) {
        out->lo[k] = clothi_float_below(box[k]);
        out->hi[k] = clothi_float_above(box[3 + k]);
    }
    out->lo[3] = out->hi[3] = 0;
}

/* --- build and refit --- */

/* First item of node j of a level; of node j + 1: the end of node j. */
static inline int clothi_bvh_item(const clothi_bvh *t, int j, int level) {
    return (int)(((uint64_t)(unsigned)j * (unsigned)t->n) >> level);
}

CLOTHI_UNUSED static void clothi_bvh_free(const cloth_hooks *hooks, clothi_bvh *t) {
    clothi_free(hooks, t->node);
    memset(t, 0, sizeof *t);
}

typedef struct clothi_bvh_job {
    clothi_bvh   *tree;
    const double *box;
    int           level;                    /* of the subtrees                                 */
} clothi_bvh_job;

static void clothi_bvh_refit_leaf(clothi_bvh *t, const double *box, int leaf) {
    const int   end = clothi_bvh_item(t, leaf + 1, t->depth);
    clothi_box *node = t->node + ((size_t)1 << t->depth) + leaf;
    int         i = clothi_bvh_item(t, leaf, t->depth);
    clothi_node_empty(node);
    for (; i < end; i++) {
        const double *b = box + 6 * (size_t)t->item[i];
        clothi_box   *r = t->bound + i;
        memcpy(t->exact + 6 * (size_t)i, b, 6 * sizeof *b);
        clothi_node_around(b, r);
        clothi_node_join(node, r, node);
    }
    clothi_node_measure(node);
}

/* Whole subtrees: leaves first, then level by level up to their roots. */
static void clothi_bvh_refit_range(int begin, int end, int worker, void *ctx) {
    const clothi_bvh_job *job = (const clothi_bvh_job *)ctx;
    clothi_bvh           *t = job->tree;
    int                   level, j;
    (void)worker;
    for (j = begin << (t->depth - job->level); j < end << (t->depth - job->level); j++)
        clothi_bvh_refit_leaf(t, job->box, j);
    for (level = t->depth - 1; level >= job->level; level--)
        for (j = begin << (level - job->level); j < end << (level - job->level); j++) {
            clothi_box *node = t->node + ((size_t)1 << level) + j;
            const clothi_box *child = t->node + ((size_t)2 << level) + 2 * (size_t)j;
            clothi_node_join(child, child + 1, node);
            clothi_node_measure(node);
        }
}

/* Takes other boxes, box [n x 6], for the same items.
 * contract: alloc none | cost O(n), ~15 ns an item | same bits for any worker count */
CLOTHI_UNUSED static void clothi_bvh_refit(const cloth_hooks *hooks, clothi_bvh *t,
                                           const double *box) {
    clothi_bvh_job job;
    int            i;
    job.tree = t;
    job.box = box;
    job.level = t->depth < CLOTHI_BVH_TASKS ? t->depth : CLOTHI_BVH_TASKS;
    clothi_for(hooks, 1 << job.level, 1, clothi_bvh_refit_range, &job);
    for (i = (1 << job.level) - 1; i > 0; i--) {
        clothi_node_join(t->node + 2 * i, t->node + 2 * i + 1, t->node + i);
        clothi_node_measure(t->node + i);
    }
}

/* One block: nodes, item bounds, item boxes, order. */
static cloth_status clothi_bvh_alloc(const cloth_hooks *hooks, int n, clothi_bvh *t) {
    size_t nodes, size;
    t->n = n;
    while (n > CLOTHI_BVH_LEAF && ((n - 1) >> t->depth) + 1 > CLOTHI_BVH_LEAF) t->depth++;
    nodes = (size_t)2 << t->depth;
    size = nodes * sizeof *t->node +
           (size_t)n * (sizeof *t->bound + 6 * sizeof *t->exact + sizeof *t->item);
    t->node = (clothi_box *)clothi_alloc(hooks, size, 1);
    if (!t->node)
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for a tree of %i boxes", t->n);
    t->bound = t->node + nodes;
    t->exact = (double *)(void *)(t->bound + n);
    t->item = (int *)(void *)(t->exact + 6 * (size_t)n);
    return CLOTH_OK;
}

/* Items [lo, hi) of the three sorted orders, halved at mid along the widest axis. side [n] and
 * tmp [n] are scratch. */
static void clothi_bvh_split(int n, const double *key, int *order, int lo, int mid, int hi,
                             unsigned char *side, int *tmp) {
    double widest = -1;
    int    axis = 0, k, i;
    for (k = 0; k < 3; k++) {
        const int    *o = order + (size_t)k * (size_t)n;
        const double *c = key + (size_t)k * (size_t)n;
        const double  extent = c[o[hi - 1]] - c[o[lo]];
        if (extent > widest) {
            widest = extent;
            axis = k;
        }
    }
    for (i = lo; i < hi; i++) side[order[(size_t)axis * (size_t)n + (size_t)i]] = i >= mid;
    for (k = 0; k < 3; k++) {
        int *o = order + (size_t)k * (size_t)n, left = lo, right = 0;
        if (k == axis) continue;
        for (i = lo; i < hi; i++) {
            if (side[o[i]]) tmp[right++] = o[i];
            else o[left++] = o[i];
        }
        memcpy(o + mid, tmp, (size_t)right * sizeof *tmp);
    }
}

/* A tree over box [n x 6] (min xyz, max xyz), n in [0, CLOTH_MAX_COUNT]; the boxes are copied.
 * out  *t      owned: clothi_bvh_free; empty on failure
 * returns CLOTH_OK, CLOTH_ERR_MEMORY
 * contract: alloc one block of ~110 n bytes and scratch | cost O(n log n) | serial build */
CLOTHI_UNUSED static cloth_status clothi_bvh_build(const cloth_hooks *hooks, int n,
                                                   const double *box, clothi_bvh *t) {
    const size_t   m = (size_t)n;
    cloth_status   status;
    double        *key = NULL;
    int           *order = NULL, *tmp, i, k, level;
    unsigned char *side;
    memset(t, 0, sizeof *t);
    status = clothi_bvh_alloc(hooks, n, t);
    key = (double *)clothi_alloc(hooks, 3 * m, sizeof *key);
    order = (int *)clothi_alloc(hooks, 4 * m * sizeof *order + m, 1);
    if (status != CLOTH_OK || !key || !order) {
        if (status == CLOTH_OK)
            status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to sort %i boxes", n);
        clothi_bvh_free(hooks, t);
        goto done;
    }
    tmp = order + 3 * m;
    side = (unsigned char *)(tmp + m);
    for (k = 0; k < 3; k++) {
        for (i = 0; i < n; i++) {
            const double centre = 0.5 * box[6 * (size_t)i + (size_t)k] +
                                  0.5 * box[6 * (size_t)i + (size_t)k + 3];
            key[(size_t)k * m + (size_t)i] = clothi_finite(centre) ? centre : 0;
            order[(size_t)k * m + (size_t)i] = i;
        }
        clothi_sort(order + (size_t)k * m, tmp, n, key + (size_t)k * m);
    }
    for (level = 0; level < t->depth; level++)
        for (i = 0; i < 1 << level; i++)
            clothi_bvh_split(n, key, order, clothi_bvh_item(t, i, level),
                             clothi_bvh_item(t, 2 * i + 1, level + 1),
                             clothi_bvh_item(t, i + 1, level), side, tmp);
    memcpy(t->item, order, m * sizeof *order);
    clothi_bvh_refit(hooks, t, box);
done:
    clothi_free(hooks, order);
    clothi_free(hooks, key);
    return status;
}

/* --- queries --- */

typedef struct clothi_bvh_query {
    const clothi_bvh *a, *b;                /* b NULL: a against itself                        */
    clothi_pairs     *pairs;
    int               level_a, level_b;     /* of the tasks                                    */
} clothi_bvh_query;

/* Items i of a against the items [j, end) of b. */
static inline void clothi_bvh_row(const clothi_bvh *a, int i, const clothi_bvh *b, int j, int end,
                                  int ordered, clothi_segment *out) {
    const clothi_box *bound = a->bound + i;
    for (; j < end; j++) {
        int p, q;
        if (!clothi_nodes_meet(bound, b->bound + j) ||
            !clothi_boxes_meet(a->exact + 6 * (size_t)i, b->exact + 6 * (size_t)j))
            continue;
        p = a->first + a->item[i];
        q = b->first + b->item[j];
        if (ordered && p > q) clothi_segment_put(out, q, p);
        else clothi_segment_put(out, p, q);
    }
}

/* Leaf na of a against leaf nb of b (node numbers); of the same tree when self. */
static void clothi_bvh_leaves(const clothi_bvh *a, int na, const clothi_bvh *b, int nb, int self,
                              clothi_segment *out) {
    const int la = na - (1 << a->depth), lb = nb - (1 << b->depth);
    const int end_a = clothi_bvh_item(a, la + 1, a->depth);
    const int begin_b = clothi_bvh_item(b, lb, b->depth);
    const int end_b = clothi_bvh_item(b, lb + 1, b->depth);
    const clothi_box *box = b->node + nb;
    int i;
    for (i = clothi_bvh_item(a, la, a->depth); i < end_a; i++) {
        if (self && na == nb) clothi_bvh_row(a, i, b, i + 1, end_b, 1, out);
        else if (clothi_nodes_meet(a->bound + i, box))
            clothi_bvh_row(a, i, b, begin_b, end_b, self, out);
    }
}

/* All item pairs below the nodes na of a and nb of b, which meet. */
static void clothi_bvh_descend(const clothi_bvh *a, int na, const clothi_bvh *b, int nb, int self,
                               clothi_segment *out) {
    const int leaf_a = 1 << a->depth, leaf_b = 1 << b->depth;
    int       stack[CLOTHI_BVH_STACK][2], n = 0;
    for (;;) {
        if (na >= leaf_a && nb >= leaf_b) {
            clothi_bvh_leaves(a, na, b, nb, self, out);
        } else if (self && na == nb) {
            const int left = 2 * na;
            stack[n][0] = stack[n][1] = left;
            n++;
            stack[n][0] = stack[n][1] = left + 1;
            n++;
            stack[n][0] = left;
            stack[n][1] = left + 1;
            n += clothi_nodes_meet(a->node + left, a->node + left + 1);
        } else if (nb >= leaf_b || (na < leaf_a && a->node[na].lo[3] >= b->node[nb].lo[3])) {
            const clothi_box *other = b->node + nb;
            stack[n][0] = 2 * na;
            stack[n][1] = nb;
            n += clothi_nodes_meet(a->node + 2 * na, other);
            stack[n][0] = 2 * na + 1;
            stack[n][1] = nb;
            n += clothi_nodes_meet(a->node + 2 * na + 1, other);
        } else {
            const clothi_box *other = a->node + na;
            stack[n][0] = na;
            stack[n][1] = 2 * nb;
            n += clothi_nodes_meet(other, b->node + 2 * nb);
            stack[n][0] = na;
            stack[n][1] = 2 * nb + 1;
            n += clothi_nodes_meet(other, b->node + 2 * nb + 1);
        }
        if (n == 0) return;
        n--;
        na = stack[n][0];
        nb = stack[n][1];
    }
}

/* Task i of a cross query: a pair of nodes; of a self query: a pair with the first not after the
 * second, row by row of the triangle. */
static void clothi_bvh_query_range(int begin, int end, int worker, void *ctx) {
    const clothi_bvh_query *q = (const clothi_bvh_query *)ctx;
    const clothi_bvh       *b = q->b ? q->b : q->a;
    const int               width = 1 << q->level_b;
    int                     task, row = 0, at;
    (void)worker;
    for (task = begin; task < end; task++) {
        clothi_segment out = clothi_segment_open(q->pairs, task);
        int            na, nb;
        if (q->b) {
            na = (1 << q->level_a) + task / width;
            nb = width + task % width;
        } else {
            for (row = 0, at = task; at >= width - row; row++) at -= width - row;
            na = width + row;
            nb = na + at;
        }
        if (clothi_nodes_meet(q->a->node + na, b->node + nb))
            clothi_bvh_descend(q->a, na, b, nb, !q->b, &out);
        q->pairs->found[task] = out.found;
    }
}

/* Every pair i < j of items whose boxes overlap (touching included), once each.
 * out  pairs   count and pair [count x 2], in an order that the tree alone decides
 * returns CLOTH_OK, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY (more than an int counts); the list is
 *   empty then
 * contract: alloc when the list outgrows its memory | cost ~ O(n log n + pairs) for surfaces |
 *   same list for any worker count */
CLOTHI_UNUSED static cloth_status clothi_bvh_self_pairs(const cloth_hooks *hooks,
                                                        const clothi_bvh *t, clothi_pairs *pairs) {
    clothi_bvh_query q;
    int              width;
    q.a = t;
    q.b = NULL;
    q.pairs = pairs;
    q.level_a = q.level_b = t->depth < CLOTHI_BVH_TASKS ? t->depth : CLOTHI_BVH_TASKS;
    width = 1 << q.level_a;
    return clothi_pairs_run(hooks, &pairs, 1, width * (width + 1) / 2, 64, clothi_bvh_query_range,
                            &q);
}

/* Every pair (item of a, item of b) whose boxes overlap; otherwise as clothi_bvh_self_pairs. */
CLOTHI_UNUSED static cloth_status clothi_bvh_cross_pairs(const cloth_hooks *hooks,
                                                         const clothi_bvh *a, const clothi_bvh *b,
                                                         clothi_pairs *pairs) {
    clothi_bvh_query q;
    q.a = a;
    q.b = b;
    q.pairs = pairs;
    q.level_a = a->depth < CLOTHI_BVH_TASKS ? a->depth : CLOTHI_BVH_TASKS;
    q.level_b = b->depth < CLOTHI_BVH_TASKS ? b->depth : CLOTHI_BVH_TASKS;
    return clothi_pairs_run(hooks, &pairs, 1, 1 << (q.level_a + q.level_b), 64,
                            clothi_bvh_query_range, &q);
}

/* The items (first + i) whose boxes overlap box [6]: returns their number, writes the first max.
 * contract: alloc none | cost O(log n + found) */
CLOTHI_UNUSED static int clothi_bvh_box_query(const clothi_bvh *t, const double *box, int max,
                                              int *items) {
    clothi_box b;
    int        stack[CLOTHI_BVH_STACK], n = 0, count = 0, i;
    clothi_node_around(box, &b);
    stack[n++] = 1;
    while (n) {
        const int node = stack[--n], leaf = node - (1 << t->depth);
        if (!clothi_nodes_meet(t->node + node, &b)) continue;
        if (leaf < 0) {
            stack[n++] = 2 * node + 1;
            stack[n++] = 2 * node;
            continue;
        }
        for (i = clothi_bvh_item(t, leaf, t->depth); i < clothi_bvh_item(t, leaf + 1, t->depth);
             i++) {
            if (!clothi_boxes_meet(t->exact + 6 * (size_t)i, box)) continue;
            if (count < max) items[count] = t->first + t->item[i];
            count++;
        }
    }
    return count;
}

/* Squared distance m^2 of a point [3] from an item (first + i). */
typedef double clothi_distance_fn(int item, const double *point, void *ctx);

static double clothi_node_distance2(const clothi_box *b, const double *p) {
    double d2 = 0;
    int    k;
    for (k = 0; k < 3; k++) {
        const double below = (double)b->lo[k] - p[k], above = p[k] - (double)b->hi[k];
        const double d = below > above ? below : above;
        if (d > 0) d2 += d * d;
    }
    return d2;
}

/* The item nearest to a point [3] by fn, if its squared distance is at most *d2; of several the
 * smallest. Returns it and sets *d2; returns -1 and leaves *d2 when there is none. fn must not be
 * less than the distance from the item's box by more than a relative 1e-9.
 * contract: alloc none | cost O(log n) for a point not far away as against the items' size */
CLOTHI_UNUSED static int clothi_bvh_nearest(const clothi_bvh *t, const double *point,
                                            clothi_distance_fn *fn, void *ctx, double *d2) {
    const double slack = 1 - 1e-9;
    int          stack[CLOTHI_BVH_STACK], n = 0, best = -1, i;
    double       reach[CLOTHI_BVH_STACK];
    stack[0] = 1;
    reach[n++] = slack * clothi_node_distance2(t->node + 1, point);
    while (n) {
        const int node = stack[--n], leaf = node - (1 << t->depth);
        if (reach[n] > *d2) continue;
        if (leaf < 0) {                     /* the nearer child on top */
            const double l = slack * clothi_node_distance2(t->node + 2 * node, point);
            const double r = slack * clothi_node_distance2(t->node + 2 * node + 1, point);
            const int    right_last = r < l;
            stack[n] = 2 * node + !right_last;
            reach[n++] = right_last ? l : r;
            stack[n] = 2 * node + right_last;
            reach[n++] = right_last ? r : l;
            continue;
        }
        for (i = clothi_bvh_item(t, leaf, t->depth); i < clothi_bvh_item(t, leaf + 1, t->depth);
             i++) {
            const int    item = t->first + t->item[i];
            const double d = fn(item, point, ctx);
            if (d < *d2 || (d <= *d2 && (best < 0 || item < best))) {
                *d2 = d;
                best = item;
            }
        }
    }
    return best;
}

/* --- features --- */

/* Vertices, edges and faces of any set of triangles, also one that is no surface. memset to 0
 * before the first build. A vertex without a face has no owner and is in no pair. */
typedef struct clothi_features {
    int            nv, ne, nf;
    const int     *faces;                   /* [nf x 3] borrowed                               */
    int           *edges;                   /* [ne x 2] a < b; sorted by a, then by b          */
    int           *face_edges;              /* [nf x 3] edge of corners k and k+1              */
    unsigned char *owned;                   /* [nf] bit k: corner k, bit 3+k: edge k is owned  */
} clothi_features;

CLOTHI_UNUSED static void clothi_features_free(const cloth_hooks *hooks, clothi_features *s) {
    clothi_free(hooks, s->edges);
    memset(s, 0, sizeof *s);
}

/* faces [nf x 3] are borrowed as long as *s lives; the smallest face owns.
 * returns CLOTH_OK; CLOTH_ERR_MESH: an index out of range, a corner twice; CLOTH_ERR_MEMORY;
 *   *s is empty then.   cost O(nv + nf) */
CLOTHI_UNUSED static cloth_status clothi_features_build(const cloth_hooks *hooks, int nv, int nf,
                                                        const int *faces, clothi_features *s) {
    clothi_edge_sort sort;
    cloth_status     status;
    int              i, end, h, ne = 0;
    memset(s, 0, sizeof *s);
    memset(&sort, 0, sizeof sort);
    status = clothi_check_counts(hooks, nv, nf);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status == CLOTH_OK) status = clothi_edge_sort_make(hooks, nv, nf, faces, &sort);
    if (status != CLOTH_OK) return status;
    for (i = 0; i < 3 * nf; i = clothi_edge_run(&sort, 3 * nf, i)) ne++;
    s->edges = (int *)clothi_alloc(hooks, (2 * (size_t)ne + 3 * (size_t)nf) * sizeof(int) +
                                              (size_t)nf, 1);
    if (!s->edges) {
        status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for %i edges", ne);
        goto done;
    }
    s->nv = nv;
    s->nf = nf;
    s->faces = faces;
    s->face_edges = s->edges + 2 * (size_t)ne;
    s->owned = (unsigned char *)(s->face_edges + 3 * (size_t)nf);
    for (i = 0; i < 3 * nf; i = end, s->ne++) {
        end = clothi_edge_run(&sort, 3 * nf, i);
        h = sort.order[i];
        s->edges[2 * s->ne] = sort.lo[h];
        s->edges[2 * s->ne + 1] = sort.hi[h];
        s->owned[h / 3] = (unsigned char)(s->owned[h / 3] | 8 << h % 3);
        for (; i < end; i++) s->face_edges[sort.order[i]] = s->ne;
    }
    memset(sort.count, 0, (size_t)nv * sizeof(int));
    for (h = 0; h < 3 * nf; h++) {
        if (sort.count[faces[h]]++) continue;
        s->owned[h / 3] = (unsigned char)(s->owned[h / 3] | 1 << h % 3);
    }
done:
    clothi_edge_sort_free(hooks, &sort);
    return status;
}

#define CLOTHI_FEATURE_CHUNK 1024           /* face pairs that a task takes                    */

typedef struct clothi_features_job {
    const clothi_features *s;
    const clothi_pairs    *faces;
    const double          *box;             /* [nv x 6]                                        */
    clothi_pairs          *vf, *ee;
} clothi_features_job;

/* A face with its boxes. */
typedef struct clothi_face_view {
    const int *v, *e;
    int        face, owned;
    double     box[6], edge[3][6];
} clothi_face_view;

static void clothi_face_look(const clothi_features_job *job, int face, clothi_face_view *w) {
    int k;
    w->face = face;
    w->v = job->s->faces + 3 * (size_t)face;
    w->e = job->s->face_edges + 3 * (size_t)face;
    w->owned = job->s->owned[face];
    for (k = 0; k < 3; k++)
        clothi_box_join(job->box + 6 * (size_t)w->v[k], job->box + 6 * (size_t)w->v[(k + 1) % 3],
                        w->edge[k]);
    clothi_box_join(w->edge[0], w->edge[1], w->box);
}

/* The vertices that f owns against face g. */
static void clothi_feature_vf(const clothi_features_job *job, const clothi_face_view *f,
                              const clothi_face_view *g, clothi_segment *out) {
    int k;
    for (k = 0; k < 3; k++) {
        const int v = f->v[k];
        if (!(f->owned >> k & 1) || v == g->v[0] || v == g->v[1] || v == g->v[2]) continue;
        if (clothi_boxes_meet(job->box + 6 * (size_t)v, g->box))
            clothi_segment_put(out, v, g->face);
    }
}

/* The edges that f owns against those that g owns. */
static void clothi_feature_ee(const clothi_face_view *f, const clothi_face_view *g,
                              clothi_segment *out) {
    int k, l;
    for (k = 0; k < 3; k++) {
        const int a = f->v[k], b = f->v[(k + 1) % 3];
        if (!(f->owned >> (3 + k) & 1) || !clothi_boxes_meet(f->edge[k], g->box)) continue;
        for (l = 0; l < 3; l++) {
            const int c = g->v[l], d = g->v[(l + 1) % 3];
            if (!(g->owned >> (3 + l) & 1) || a == c || a == d || b == c || b == d) continue;
            if (clothi_boxes_meet(f->edge[k], g->edge[l]))
                clothi_segment_put(out, f->e[k] < g->e[l] ? f->e[k] : g->e[l],
                                   f->e[k] < g->e[l] ? g->e[l] : f->e[k]);
        }
    }
}

static void clothi_features_range(int begin, int end, int worker, void *ctx) {
    const clothi_features_job *job = (const clothi_features_job *)ctx;
    int task;
    (void)worker;
    for (task = begin; task < end; task++) {
        const int n = job->faces->count;
        const int last = n - task * CLOTHI_FEATURE_CHUNK < CLOTHI_FEATURE_CHUNK
                             ? n : (task + 1) * CLOTHI_FEATURE_CHUNK;
        clothi_segment   vf = clothi_segment_open(job->vf, task);
        clothi_segment   ee = clothi_segment_open(job->ee, task);
        clothi_face_view f, g;
        int              i;
        f.face = -1;
        for (i = task * CLOTHI_FEATURE_CHUNK; i < last; i++) {
            const int *pair = job->faces->pair + 2 * (size_t)i;
            if (pair[0] != f.face) clothi_face_look(job, pair[0], &f);
            clothi_face_look(job, pair[1], &g);
            clothi_feature_vf(job, &f, &g, &vf);
            clothi_feature_vf(job, &g, &f, &vf);
            clothi_feature_ee(&f, &g, &ee);
        }
        job->vf->found[task] = vf.found;
        job->ee->found[task] = ee.found;
    }
}

/* From pairs of faces to the pairs (vertex, face) and (edge, edge), smaller edge first, whose boxes
 * overlap and that share no vertex; each once if each pair of faces is there once.
 * in   faces       pairs of faces of s, in its numbering. All those that the boxes allow between
 *                  two groups of faces: leaving single ones out loses features of their neighbours
 * in   vertex_box  [nv x 6] the boxes that the pairs of faces were made from (clothi_swept_boxes)
 * out  vf, ee      count and pair [count x 2]
 * returns CLOTH_OK, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY; both lists empty then
 * contract: alloc when a list outgrows its memory | cost O(pairs) | same lists for any worker
 *   count */
CLOTHI_UNUSED static cloth_status clothi_pairs_features(const cloth_hooks *hooks,
                                                        const clothi_features *s,
                                                        const clothi_pairs *faces,
                                                        const double *vertex_box, clothi_pairs *vf,
                                                        clothi_pairs *ee) {
    clothi_features_job job;
    clothi_pairs       *list[2];
    job.s = s;
    job.faces = faces;
    job.box = vertex_box;
    job.vf = list[0] = vf;
    job.ee = list[1] = ee;
    return clothi_pairs_run(hooks, list, 2,
                            faces->count / CLOTHI_FEATURE_CHUNK +
                                (faces->count % CLOTHI_FEATURE_CHUNK != 0),
                            2 * CLOTHI_FEATURE_CHUNK, clothi_features_range, &job);
}

/* ===== [5.2] TRIANGLES THAT INTERSECT =========================================================
 *
 *        a                  Two faces intersect when the closed triangles have a point in common
 *       /|\                 that does not lie on what they share by vertex number: nothing, a
 *      / |.\.....d          vertex, an edge. Touching counts; a face on top of its twin (three
 *     /  X  \   /           shared vertices) does not. A triangle without area is the segment or
 *    v---|---b /            the point that its corners span.
 *     \  |    /
 *      ..|.../                0 shared   they meet iff an edge of one meets the other: a corner
 *        c                               of the common part lies on an edge of one of them.
 *                             1, v       a ray from v through a common point leaves one of the
 *                                        triangles first, on its side opposite v: they meet
 *                                        beyond v iff ab meets vcd or cd meets vab.
 *                             2          in one plane, on the same side of the edge.
 *
 *   Every answer is a combination of signs of determinants, and those are exact [3.1]: of four
 *   points in space, or of three in a projection along an axis. An edge pq meets a triangle
 *   whose plane it crosses iff the volumes pq t0t1, pq t1t2, pq t2t0 do not have both signs; in
 *   the plane, plane geometry in a projection that does not flatten it. On one line the order is
 *   that of coordinates, x first, then y, then z. No rounding decides; there is no epsilon.
 * checked: tests/test_intersect.c, against rational arithmetic (tests/exact.h) */

/* Sign of the volume a b c d; at once when all are at one height, as in a sheet before it falls. */
static int clothi_volume(const double *a, const double *b, const double *c, const double *d) {
    int k;
    for (k = 0; k < 3; k++)
        if (a[k] == b[k] && a[k] == c[k] && a[k] == d[k]) return 0;
    return clothi_orient3d(a, b, c, d);
}

/* Turn of the projection of a, b, c along an axis: 0 when on a line. */
static int clothi_turn_of(const double *a, const double *b, const double *c, int axis) {
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    double    p[3][2];
    p[0][0] = a[i]; p[0][1] = a[j];
    p[1][0] = b[i]; p[1][1] = b[j];
    p[2][0] = c[i]; p[2][1] = c[j];
    return clothi_orient2d(p[0], p[1], p[2]);
}

/* An axis along which the triangle keeps an area, -1 when it has none. */
static int clothi_open_axis(const double *a, const double *b, const double *c) {
    int axis;
    for (axis = 2; axis >= 0; axis--)
        if (clothi_turn_of(a, b, c, axis)) return axis;
    return -1;
}

/* Order of points, x first: along any line it is that of the line. */
static int clothi_point_order(const double *a, const double *b) {
    int k;
    for (k = 0; k < 3; k++)
        if (a[k] < b[k] || a[k] > b[k]) return a[k] < b[k] ? -1 : 1;
    return 0;
}

/* -1, 0, 1: p before, on, behind the segment ab, all three on one line. */
static int clothi_beside(const double *p, const double *a, const double *b) {
    const int from_a = clothi_point_order(p, a), from_b = clothi_point_order(p, b);
    return from_a * from_b > 0 ? from_a : 0;
}

/* Closed segments pq and rs in one plane, which keeps its area along the axis. */
static int clothi_segments_in_plane(const double *p, const double *q, const double *r,
                                    const double *s, int axis) {
    const int sr = clothi_turn_of(p, q, r, axis), ss = clothi_turn_of(p, q, s, axis);
    const int sp = clothi_turn_of(r, s, p, axis), sq = clothi_turn_of(r, s, q, axis);
    if (sr * ss < 0 && sp * sq < 0) return 1;
    return (sr == 0 && clothi_beside(r, p, q) == 0) || (ss == 0 && clothi_beside(s, p, q) == 0) ||
           (sp == 0 && clothi_beside(p, r, s) == 0) || (sq == 0 && clothi_beside(q, r, s) == 0);
}

/* Closed segments anywhere. */
static int clothi_segments_meet(const double *p, const double *q, const double *r,
                                const double *s) {
    int axis;
    if (clothi_volume(p, q, r, s)) return 0;
    axis = clothi_open_axis(p, q, r);
    if (axis < 0) axis = clothi_open_axis(p, q, s);
    if (axis < 0) axis = clothi_open_axis(r, s, p);
    if (axis < 0) axis = clothi_open_axis(r, s, q);
    if (axis >= 0) return clothi_segments_in_plane(p, q, r, s, axis);
    return clothi_beside(p, r, s) == 0 || clothi_beside(q, r, s) == 0 ||
           clothi_beside(r, p, q) == 0;
}

/* 1 when the signs do not have both -1 and 1. */
static int clothi_one_sign(int a, int b, int c) {
    return !((a < 0 || b < 0 || c < 0) && (a > 0 || b > 0 || c > 0));
}

/* Segment pq, whose ends have the signs sp and sq against the plane of t, and the closed triangle
 * t, which has an area. */
static int clothi_edge_meets(const double *p, const double *q, int sp, int sq,
                             const double *const *t) {
    int k, axis;
    if (sp * sq > 0) return 0;
    if (sp || sq)
        return clothi_one_sign(clothi_volume(p, q, t[0], t[1]),
                               clothi_volume(p, q, t[1], t[2]),
                               clothi_volume(p, q, t[2], t[0]));
    axis = clothi_open_axis(t[0], t[1], t[2]);
    if (clothi_one_sign(clothi_turn_of(t[0], t[1], p, axis),
                        clothi_turn_of(t[1], t[2], p, axis),
                        clothi_turn_of(t[2], t[0], p, axis)))
        return 1;
    for (k = 0; k < 3; k++)
        if (clothi_segments_in_plane(p, q, t[k], t[(k + 1) % 3], axis)) return 1;
    return 0;
}

/* Signs of the corners of g against the plane of f; 1 when all are on one side. */
static int clothi_plane_signs(const double *const *f, const double *const *g, int *sign) {
    int k;
    for (k = 0; k < 3; k++) sign[k] = clothi_volume(f[0], f[1], f[2], g[k]);
    return sign[0] && sign[0] == sign[1] && sign[1] == sign[2];
}

/* Closed triangles without a shared vertex. */
static int clothi_triangles_meet(const double *const *f, const double *const *g) {
    int of_f[3], of_g[3], f_area, g_area, k, l;
    if (clothi_plane_signs(f, g, of_g) || clothi_plane_signs(g, f, of_f)) return 0;
    f_area = of_g[0] || of_g[1] || of_g[2] || clothi_open_axis(f[0], f[1], f[2]) >= 0;
    g_area = of_f[0] || of_f[1] || of_f[2] || clothi_open_axis(g[0], g[1], g[2]) >= 0;
    for (k = 0; k < 3; k++) {
        l = (k + 1) % 3;
        if (f_area && clothi_edge_meets(g[k], g[l], of_g[k], of_g[l], f)) return 1;
        if (g_area && clothi_edge_meets(f[k], f[l], of_f[k], of_f[l], g)) return 1;
    }
    if (f_area || g_area) return 0;
    for (k = 0; k < 9; k++)
        if (clothi_segments_meet(f[k / 3], f[(k / 3 + 1) % 3], g[k % 3], g[(k % 3 + 1) % 3]))
            return 1;
    return 0;
}

/* p, not v, in the closed angle c v d of a triangle with area. */
static int clothi_in_angle(const double *v, const double *c, const double *d, const double *p) {
    const int axis = clothi_open_axis(v, c, d);
    int       turn;
    if (clothi_point_order(p, v) == 0 || clothi_volume(v, c, d, p)) return 0;
    turn = clothi_turn_of(v, c, d, axis);
    return clothi_turn_of(v, c, p, axis) * turn >= 0 && clothi_turn_of(v, p, d, axis) * turn >= 0;
}

/* a and c, neither of them v, in one direction from v. */
static int clothi_one_way(const double *v, const double *a, const double *c) {
    const int order = clothi_point_order(a, v);
    return order && clothi_point_order(c, v) == order && clothi_open_axis(v, a, c) < 0;
}

/* Triangles f = v a b and g = v c d. One without area is two segments from v. */
static int clothi_meet_beyond_vertex(const double *const *f, const double *const *g) {
    const double *v = f[0];
    const int     c = clothi_volume(v, f[1], f[2], g[1]);
    const int     d = clothi_volume(v, f[1], f[2], g[2]);
    int           a, b, f_area, g_area;
    if (c * d > 0) return 0;
    a = clothi_volume(v, g[1], g[2], f[1]);
    b = clothi_volume(v, g[1], g[2], f[2]);
    if (a * b > 0) return 0;
    f_area = c || d || clothi_open_axis(v, f[1], f[2]) >= 0;
    g_area = a || b || clothi_open_axis(v, g[1], g[2]) >= 0;
    if (f_area && g_area)
        return clothi_edge_meets(f[1], f[2], a, b, g) || clothi_edge_meets(g[1], g[2], c, d, f);
    if (g_area)
        return clothi_in_angle(v, g[1], g[2], f[1]) || clothi_in_angle(v, g[1], g[2], f[2]);
    if (f_area)
        return clothi_in_angle(v, f[1], f[2], g[1]) || clothi_in_angle(v, f[1], f[2], g[2]);
    return clothi_one_way(v, f[1], g[1]) || clothi_one_way(v, f[1], g[2]) ||
           clothi_one_way(v, f[2], g[1]) || clothi_one_way(v, f[2], g[2]);
}

/* Triangles u w a and u w b. Without area: segments along the line of the edge, or from u = w. */
static int clothi_meet_beyond_edge(const double *u, const double *w, const double *a,
                                   const double *b) {
    int axis, side;
    if (clothi_volume(u, w, a, b)) return 0;
    axis = clothi_open_axis(u, w, a);
    if (axis >= 0) return clothi_turn_of(u, w, a, axis) * clothi_turn_of(u, w, b, axis) > 0;
    if (clothi_open_axis(u, w, b) >= 0 || clothi_open_axis(u, a, b) >= 0) return 0;
    side = clothi_beside(a, u, w);
    return side && clothi_beside(b, u, w) == side;
}

/* Faces f [3] and g [3], no corner named twice, of finite positions x: 1 when they intersect as
 * the banner says.   cost: 6 signs when apart or beside each other, up to ~100 in one plane */
CLOTHI_UNUSED static int clothi_faces_intersect(const double *x, const int *f, const int *g) {
    const double *p[3], *q[3];
    int           shared = 0, at_f[3], at_g[3], i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (f[i] == g[j]) {
                at_f[shared] = i;
                at_g[shared++] = j;
            }
    if (shared == 3) return 0;
    if (shared == 2)
        return clothi_meet_beyond_edge(x + 3 * (size_t)f[at_f[0]], x + 3 * (size_t)f[at_f[1]],
                                       x + 3 * (size_t)f[3 - at_f[0] - at_f[1]],
                                       x + 3 * (size_t)g[3 - at_g[0] - at_g[1]]);
    for (i = 0; i < 3; i++) {               /* a shared vertex comes first */
        p[i] = x + 3 * (size_t)f[(i + (shared ? at_f[0] : 0)) % 3];
        q[i] = x + 3 * (size_t)g[(i + (shared ? at_g[0] : 0)) % 3];
    }
    return shared ? clothi_meet_beyond_vertex(p, q) : clothi_triangles_meet(p, q);
}

#define CLOTHI_CROSSING_CHUNK 1024          /* pairs of faces that a task takes                */

typedef struct clothi_crossing_job {
    const double       *x;
    const int          *faces;
    const clothi_pairs *candidates;
    clothi_pairs       *out;
} clothi_crossing_job;

static void clothi_crossing_range(int begin, int end, int worker, void *ctx) {
    const clothi_crossing_job *job = (const clothi_crossing_job *)ctx;
    int task, i;
    (void)worker;
    for (task = begin; task < end; task++) {
        const int n = job->candidates->count, from = task * CLOTHI_CROSSING_CHUNK;
        const int to = n - from < CLOTHI_CROSSING_CHUNK ? n : from + CLOTHI_CROSSING_CHUNK;
        clothi_segment out = clothi_segment_open(job->out, task);
        for (i = from; i < to; i++) {
            const int *pair = job->candidates->pair + 2 * (size_t)i;
            if (clothi_faces_intersect(job->x, job->faces + 3 * (size_t)pair[0],
                                       job->faces + 3 * (size_t)pair[1]))
                clothi_segment_put(&out, pair[0], pair[1]);
        }
        job->out->found[task] = out.found;
    }
}

/* Those of the candidates, pairs of faces [nf x 3] whose boxes at x [nv x 3] overlap, that
 * intersect; in their order.
 * out  out     count and pair [count x 2], not the same list as candidates
 * returns CLOTH_OK, CLOTH_ERR_MEMORY, CLOTH_ERR_CAPACITY; out empty then
 * contract: alloc when out outgrows its memory | ~0.1 us a candidate | same list for any worker
 *   count */
CLOTHI_UNUSED static cloth_status clothi_crossing_pairs(const cloth_hooks *hooks, const double *x,
                                                        const int *faces,
                                                        const clothi_pairs *candidates,
                                                        clothi_pairs *out) {
    clothi_crossing_job job;
    job.x = x;
    job.faces = faces;
    job.candidates = candidates;
    job.out = out;
    return clothi_pairs_run(hooks, &out, 1,
                            candidates->count / CLOTHI_CROSSING_CHUNK +
                                (candidates->count % CLOTHI_CROSSING_CHUNK != 0),
                            4, clothi_crossing_range, &job);
}

/* The list in increasing order of (first, second), all in [0, n). */
CLOTHI_UNUSED static cloth_status clothi_pairs_sort(const cloth_hooks *hooks, int n,
                                                    clothi_pairs *p) {
    const size_t m = (size_t)p->count;
    int         *work, *key, *in, *out, *count, i, k;
    if (p->count < 2) return CLOTH_OK;
    work = (int *)clothi_alloc(hooks, 5 * m + (size_t)n + 1u, sizeof *work);
    if (!work)
        return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory to sort %i pairs", p->count);
    key = work + 2 * m;
    in = key + m;
    out = in + m;
    count = out + m;
    for (k = 1; k >= 0; k--) {
        for (i = 0; i < p->count; i++) key[i] = p->pair[2 * i + k];
        clothi_sort_by(p->count, n, key, k ? NULL : in, k ? in : out, count);
    }
    for (i = 0; i < p->count; i++) memcpy(work + 2 * i, p->pair + 2 * out[i], 2 * sizeof *work);
    memcpy(p->pair, work, 2 * m * sizeof *work);
    clothi_free(hooks, work);
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_intersections(const cloth_hooks *hooks, int nv, const double *x,
                                           int nf, const int *faces, int max_pairs, int *pairs,
                                           int *count) {
    cloth_status status;
    double      *box = NULL;
    ptrdiff_t    bad;
    clothi_bvh   tree;
    clothi_pairs near_by, found;
    memset(&tree, 0, sizeof tree);
    memset(&near_by, 0, sizeof near_by);
    memset(&found, 0, sizeof found);
    if (count) *count = 0;
    if ((!x && nv > 0) || (!faces && nf > 0) || (!pairs && max_pairs > 0) || max_pairs < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT,
                           "cloth_intersections: %s", max_pairs < 0 ? "max_pairs < 0"
                           : !x && nv > 0 ? "x is NULL" : !faces && nf > 0 ? "faces is NULL"
                           : "pairs is NULL");
    status = clothi_check_counts(hooks, nv, nf);
    if (status == CLOTH_OK) status = clothi_check_faces(hooks, nv, nf, faces);
    if (status != CLOTH_OK) return status;
    bad = clothi_find_nonfinite(x, 3 * (size_t)nv);
    if (bad >= 0)
        return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "cloth_intersections: x[%z] = %g",
                           (size_t)bad, x[bad]);
    box = (double *)clothi_alloc(hooks, 6 * ((size_t)nv + (size_t)nf), sizeof *box);
    if (!box) {
        status = clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for the boxes of %i faces", nf);
        goto done;
    }
    clothi_swept_boxes(nv, x, NULL, 0, box);
    clothi_face_boxes(nf, faces, box, box + 6 * (size_t)nv);
    status = clothi_bvh_build(hooks, nf, box + 6 * (size_t)nv, &tree);
    if (status == CLOTH_OK) status = clothi_bvh_self_pairs(hooks, &tree, &near_by);
    if (status == CLOTH_OK) status = clothi_crossing_pairs(hooks, x, faces, &near_by, &found);
    if (status == CLOTH_OK) status = clothi_pairs_sort(hooks, nf, &found);
    if (status != CLOTH_OK) goto done;
    if (count) *count = found.count;
    if (found.count < max_pairs) max_pairs = found.count;
    if (max_pairs > 0) memcpy(pairs, found.pair, 2 * (size_t)max_pairs * sizeof *pairs);
done:
    clothi_pairs_free(hooks, &found);
    clothi_pairs_free(hooks, &near_by);
    clothi_bvh_free(hooks, &tree);
    clothi_free(hooks, box);
    return status;
}

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
