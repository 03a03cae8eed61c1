/* reference.h - the elements once more, in long double and by other formulas than clothsim.h uses:
 * strain from squared edge lengths, the hinge angle from half-angles of in-plane directions.
 * Derivatives by central differences of these energies with Richardson extrapolation. */
#ifndef CLOTH_REFERENCE_H
#define CLOTH_REFERENCE_H

#include <math.h>
#include <string.h>

typedef long double ref_real;
typedef ref_real ref_energy_fn(const ref_real *x, const void *ctx);

/* ---- random numbers: splitmix64 ------------------------------------------------------------- */

static inline unsigned long long ref_next(unsigned long long *seed) {
    unsigned long long z = (*seed += 0x9e3779b97f4a7c15ull);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
}

static inline double ref_uniform(unsigned long long *seed, double a, double b) {
    return a + (b - a) * (double)(ref_next(seed) >> 11) / 9007199254740992.0;
}

/* A rotation matrix [3x3] from a random unit quaternion. */
static inline void ref_rotation(unsigned long long *seed, double *R) {
    double q[4], n = 0;
    int    i;
    do {
        for (i = 0, n = 0; i < 4; i++) {
            q[i] = ref_uniform(seed, -1, 1);
            n += q[i] * q[i];
        }
    } while (n > 1 || n < 0.01);
    for (i = 0; i < 4; i++) q[i] /= sqrt(n);
    R[0] = 1 - 2 * (q[2] * q[2] + q[3] * q[3]);
    R[1] = 2 * (q[1] * q[2] - q[0] * q[3]);
    R[2] = 2 * (q[1] * q[3] + q[0] * q[2]);
    R[3] = 2 * (q[1] * q[2] + q[0] * q[3]);
    R[4] = 1 - 2 * (q[1] * q[1] + q[3] * q[3]);
    R[5] = 2 * (q[2] * q[3] - q[0] * q[1]);
    R[6] = 2 * (q[1] * q[3] - q[0] * q[2]);
    R[7] = 2 * (q[2] * q[3] + q[0] * q[1]);
    R[8] = 1 - 2 * (q[1] * q[1] + q[2] * q[2]);
}

static inline void ref_move(const double *R, const double *shift, int n, double *x) {
    int i, r;
    for (i = 0; i < n; i++) {
        double y[3];
        for (r = 0; r < 3; r++)
            y[r] = R[3 * r] * x[3 * i] + R[3 * r + 1] * x[3 * i + 1] + R[3 * r + 2] * x[3 * i + 2]
                   + shift[r];
        memcpy(x + 3 * i, y, sizeof y);
    }
}

/* ---- energies ------------------------------------------------------------------------------- */

static inline ref_real ref_dist2(const ref_real *a, const ref_real *b) {
    ref_real d0 = a[0] - b[0], d1 = a[1] - b[1], d2 = a[2] - b[2];
    return d0 * d0 + d1 * d1 + d2 * d2;
}

typedef struct ref_spring { double L, k; } ref_spring;
static inline ref_real ref_spring_energy(const ref_real *x, const void *ctx) {
    const ref_spring *s = (const ref_spring *)ctx;
    ref_real          d = sqrtl(ref_dist2(x, x + 3)) - (ref_real)s->L;
    return (ref_real)s->k / 2 * d * d;
}

/* Strain by metric: for every edge vector Z of the rest triangle Z'EZ = (|z|^2 - |Z|^2)/2; three
 * edges give the three components (Cramer's rule). */
typedef struct ref_stretch { double X[6], mu, lambda; } ref_stretch;
static inline ref_real ref_stretch_energy(const ref_real *x, const void *ctx) {
    const ref_stretch *s = (const ref_stretch *)ctx;
    ref_real           m[3][3], b[3], E[3], det, heron, side[3], p, tr;
    int                i, c;
    for (i = 0; i < 3; i++) {
        const int j = (i + 1) % 3;
        ref_real  zx = (ref_real)s->X[2 * j] - (ref_real)s->X[2 * i];
        ref_real  zy = (ref_real)s->X[2 * j + 1] - (ref_real)s->X[2 * i + 1];
        m[i][0] = zx * zx;
        m[i][1] = zy * zy;
        m[i][2] = 2 * zx * zy;
        side[i] = sqrtl(zx * zx + zy * zy);
        b[i] = (ref_dist2(x + 3 * i, x + 3 * j) - zx * zx - zy * zy) / 2;
    }
#define REF_DET3(a)                                                                              \
    (a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1])                                           \
     - a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0])                                         \
     + a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]))
    det = REF_DET3(m);
    for (c = 0; c < 3; c++) {
        ref_real k[3][3];
        memcpy(k, m, sizeof k);
        for (i = 0; i < 3; i++) k[i][c] = b[i];
        E[c] = REF_DET3(k) / det;
    }
#undef REF_DET3
    p = (side[0] + side[1] + side[2]) / 2;
    heron = sqrtl(p * (p - side[0]) * (p - side[1]) * (p - side[2]));
    tr = E[0] + E[1];
    return heron * ((ref_real)s->mu * (E[0] * E[0] + E[1] * E[1] + 2 * E[2] * E[2])
                    + (ref_real)s->lambda / 2 * tr * tr);
}

/* The unit vectors from the edge to the two corners, across the edge, are opposite when the hinge
 * is flat: with sum s and difference d, tan(|theta|/2) = |s|/|d|. The volume gives the sign. */
static inline ref_real ref_dihedral(const ref_real *x) {
    ref_real e[3], l2 = ref_dist2(x, x + 3), m[2][3], s2 = 0, d2 = 0, vol = 0;
    int      k, i;
    for (i = 0; i < 3; i++) e[i] = x[3 + i] - x[i];
    for (k = 0; k < 2; k++) {
        const ref_real *c = x + 6 + 3 * k;
        ref_real        t = 0, n = 0;
        for (i = 0; i < 3; i++) t += (c[i] - x[i]) * e[i];
        for (i = 0; i < 3; i++) {
            m[k][i] = c[i] - x[i] - t / l2 * e[i];
            n += m[k][i] * m[k][i];
        }
        for (i = 0; i < 3; i++) m[k][i] /= sqrtl(n);
    }
    for (i = 0; i < 3; i++) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        s2 += (m[0][i] + m[1][i]) * (m[0][i] + m[1][i]);
        d2 += (m[0][i] - m[1][i]) * (m[0][i] - m[1][i]);
        vol += e[i] * (m[0][a] * m[1][b] - m[0][b] * m[1][a]);
    }
    return (vol > 0 ? -2 : 2) * atan2l(sqrtl(s2), sqrtl(d2));
}

typedef struct ref_hinge { double c, theta0; } ref_hinge;
static inline ref_real ref_hinge_energy(const ref_real *x, const void *ctx) {
    const ref_hinge *h = (const ref_hinge *)ctx;
    ref_real         d = ref_dihedral(x) - (ref_real)h->theta0;
    return (ref_real)h->c / 2 * d * d;
}
/* The same with the difference taken into [-pi, pi], as a sim's hinges do. */
static inline ref_real ref_hinge_wrapped(const ref_real *x, const void *ctx) {
    const ref_hinge *h = (const ref_hinge *)ctx;
    const ref_real   turn = 8 * (ref_real)0.78539816339744830961566084581987572L;
    ref_real         d = ref_dihedral(x) - (ref_real)h->theta0;
    while (d > turn / 2) d -= turn;
    while (d < -turn / 2) d += turn;
    return (ref_real)h->c / 2 * d * d;
}
static inline ref_real ref_dihedral_fn(const ref_real *x, const void *ctx) {
    (void)ctx;
    return ref_dihedral(x);
}

/* Quadratic bending from the rest shape's feet: the vector from the foot of each corner on the edge
 * to the corner, divided by its rest height, summed over the wings. */
typedef struct ref_quadratic { double foot[2], height[2], c; } ref_quadratic;
static inline ref_real ref_quadratic_energy(const ref_real *x, const void *ctx) {
    const ref_quadratic *q = (const ref_quadratic *)ctx;
    ref_real             sum = 0;
    int                  i, k;
    for (i = 0; i < 3; i++) {
        ref_real s = 0;
        for (k = 0; k < 2; k++) {
            ref_real foot = x[i] + (ref_real)q->foot[k] * (x[3 + i] - x[i]);
            s += (x[6 + 3 * k + i] - foot) / (ref_real)q->height[k];
        }
        sum += s * s;
    }
    return (ref_real)q->c / 2 * sum;
}

/* ---- derivatives ---------------------------------------------------------------------------- */

/* Three central differences with steps s, s/2, s/4: errors s^2 and s^4 cancel, s^6 is left. */
static inline ref_real ref_richardson(const ref_real d[3]) {
    ref_real a = (4 * d[1] - d[0]) / 3, b = (4 * d[2] - d[1]) / 3;
    return (16 * b - a) / 15;
}

static inline void ref_gradient(ref_energy_fn *fn, const void *ctx, const double *x, int n,
                                double step, double *grad) {
    ref_real y[12], d[3];
    int      i, k;
    for (i = 0; i < n; i++) y[i] = (ref_real)x[i];
    for (i = 0; i < n; i++) {
        for (k = 0; k < 3; k++) {
            const ref_real h = (ref_real)step / (ref_real)(1 << k), at = y[i];
            ref_real       up, down;
            y[i] = at + h;
            up = fn(y, ctx);
            y[i] = at - h;
            down = fn(y, ctx);
            y[i] = at;
            d[k] = (up - down) / (2 * h);
        }
        grad[i] = (double)ref_richardson(d);
    }
}

static inline void ref_hessian(ref_energy_fn *fn, const void *ctx, const double *x, int n,
                               double step, double *hess) {
    ref_real y[12], d[3];
    int      i, j, k, s;
    for (i = 0; i < n; i++) y[i] = (ref_real)x[i];
    for (i = 0; i < n; i++)
        for (j = 0; j <= i; j++) {
            for (k = 0; k < 3; k++) {
                const ref_real h = (ref_real)step / (ref_real)(1 << k);
                ref_real       v[4];
                for (s = 0; s < 4; s++) {   /* i == j: second difference with step 2h and 0      */
                    const ref_real yi = y[i], yj = y[j];
                    y[i] += s & 1 ? h : -h;
                    y[j] += s & 2 ? h : -h;
                    v[s] = fn(y, ctx);
                    y[i] = yi;
                    y[j] = yj;
                }
                d[k] = (v[3] - v[1] - v[2] + v[0]) / (4 * h * h);
            }
            hess[n * i + j] = hess[n * j + i] = (double)ref_richardson(d);
        }
}

/* Largest |a - b| over the largest |b|; NaN counts as 1e300. */
static inline double ref_difference(const double *a, const double *b, int n) {
    double worst = 0, big = 0;
    int    i;
    for (i = 0; i < n; i++) {
        const double d = fabs(a[i] - b[i]);
        if (!(d <= worst)) worst = d <= 1e300 ? d : 1e300;
        if (fabs(b[i]) > big) big = fabs(b[i]);
    }
    return big > 0 ? worst / big : worst;
}

/* Smallest eigenvalue of a symmetric [n x n], n <= 12, over its largest magnitude (Jacobi). */
static inline double ref_smallest_eigenvalue(const double *matrix, int n) {
    double a[144], lo = 0, big = 0;
    int    sweep, p, q, k;
    memcpy(a, matrix, (size_t)(n * n) * sizeof *a);
    for (sweep = 0; sweep < 30; sweep++)
        for (p = 0; p < n; p++)
            for (q = p + 1; q < n; q++) {
                double apq = a[n * p + q], tau, t, c, s;
                if (fabs(apq) < 1e-300) continue;
                tau = (a[n * q + q] - a[n * p + p]) / (2 * apq);
                t = (tau >= 0 ? 1 : -1) / (fabs(tau) + sqrt(1 + tau * tau));
                c = 1 / sqrt(1 + t * t);
                s = t * c;
                for (k = 0; k < n; k++) {
                    double akp = a[n * k + p], akq = a[n * k + q];
                    a[n * k + p] = c * akp - s * akq;
                    a[n * k + q] = s * akp + c * akq;
                }
                for (k = 0; k < n; k++) {
                    double apk = a[n * p + k], aqk = a[n * q + k];
                    a[n * p + k] = c * apk - s * aqk;
                    a[n * q + k] = s * apk + c * aqk;
                }
            }
    for (k = 0; k < n; k++) {
        const double v = a[n * k + k];
        if (k == 0 || v < lo) lo = v;
        if (fabs(v) > big) big = fabs(v);
    }
    return big > 0 ? lo / big : 0;
}

#endif
