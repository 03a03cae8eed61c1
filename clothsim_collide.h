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

/* ===== [2.1] CONTINUOUS DETECTION ============================================================ */

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

/* ===== [3.2] DISTANCES ======================================================================= */

/* ===== [4.1] CONTINUOUS DETECTION ============================================================ */

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
