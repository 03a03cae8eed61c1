/* test_friction.c - the proximity potential and friction by themselves: the barrier against the
 * integral of its force, E_col of one pair and of joined pairs against differences, friction that
 * sticks and slides, what a contact leaves to the next step.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_friction.c -lm
 */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "reference.h"

#define T 2e-3
#define U (T - 0.25 * T)                    /* how far in the pole is                          */

/* --- the barrier --- */

/* K u^2/(t (1 - u/U)^2), as the law is told in section [8.2]. */
static long double law(long double K, long double t, long double pole, long double u) {
    return u > 0 ? K * u * u / (t * (1 - u / pole) * (1 - u / pole)) : 0;
}

/* Its integral from 0 to u by Gauss's rule of 5 points on n parts. */
static long double integral(long double K, long double t, long double pole, long double u, int n) {
    static const long double at[3] = {0, 0.538469310105683091036314420700208805L,
                                      0.906179845938663992797626878299392965L};
    static const long double weight[3] = {0.568888888888888888888888888888888889L,
                                          0.478628670499366468041291514835638193L,
                                          0.236926885056189087514264040719917363L};
    long double sum = 0, h = u / n / 2;
    int         i, k;
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            const long double mid = (2 * i + 1) * h;
            sum += weight[k] * law(K, t, pole, mid + h * at[k]) * h;
            if (k) sum += weight[k] * law(K, t, pole, mid - h * at[k]) * h;
        }
    return sum;
}

/* From the end of the series to a millionth before the pole, over other ranges too. */
static void barrier(void) {
    static const double part[] = {1e-9, 1e-4, 0.01, 0.05, 0.0999, 0.1, 0.1001, 0.3, 0.5, 0.8,
                                  0.95, 0.99};
    const double        K = 37, ranges[3] = {2e-3, 0.5, 1e-5};
    size_t              i, j;
    double              worst = 0;
    {
        double f = 3, s = 4;                /* both are added up */
        clothi_barrier(K, T, U, 0, &f, &s);
        clothi_barrier(K, T, U, -1, &f, &s);
        clothi_barrier(K, T, U, U, &f, &s);
        CHECK(f >= 3 && f <= 3 && s >= 4 && s <= 4);
        clothi_barrier(K, T, U, 0.5 * U, &f, &s);
        CHECK(f > 3 && s > 4);
        CHECK(!(clothi_barrier_energy(K, T, U, 0) > 0 || clothi_barrier_energy(K, T, U, -1) > 0));
        CHECK(clothi_barrier_energy(K, T, U, U) > 1e300);
        CHECK(clothi_barrier_energy(K, T, U, 2 * U) > 1e300);
    }
    if (!test_long_double()) SKIP("long double has the bits of double here");
    for (j = 0; j < 3; j++)
        for (i = 0; i < sizeof part / sizeof *part; i++) {
            const double t = ranges[j], pole = (j ? 0.6 : 0.775) * t, u = part[i] * pole;
            double       f = 0, s = 0, f0 = 0, f1 = 0, unused = 0, e;
            long double  want = integral((long double)K, (long double)t, (long double)pole,
                                         (long double)u, 4000);
            const double right = (double)law((long double)K, (long double)t, (long double)pole,
                                             (long double)u);
            clothi_barrier(K, t, pole, u, &f, &s);
            e = clothi_barrier_energy(K, t, pole, u);
            worst = fmax(worst, fabs((double)((long double)e / want - 1)));
            CHECK_REL(e, want, 1e-12);
            CHECK_REL(f, right, 1e-14);
            clothi_barrier(K, t, pole, u * (1 + 1e-5), &f1, &unused);
            clothi_barrier(K, t, pole, u * (1 - 1e-5), &f0, &unused);
            CHECK_REL(s, (f1 - f0) / (2e-5 * u), 1e-3);
        }
    printf("  the barrier's energy off its force's integral by %.1e at most\n", worst);
}

/* --- pairs --- */

#define MOST 8

/* A collide of `n` contacts between vertices of cloth, nv of them. */
typedef struct rig {
    cloth_collide  c;
    clothi_contact q[MOST];
    cloth_eval     e;
    double         xa[3 * MOST], xb[3 * MOST], frame[3 * MOST], grad[3 * MOST], mass[MOST];
    cloth_sim      sim;
    cloth_model    model;
} rig;

static void rig_start(rig *r, int n, int nv) {
    int i;
    memset(r, 0, sizeof *r);
    for (i = 0; i < MOST; i++) r->mass[i] = 1e-3;
    r->c.desc = cloth_collide_desc_default();
    r->c.nv = nv, r->c.nw = nv;
    r->c.xa = r->xa, r->c.xb = r->xb, r->c.x_frame = r->frame;
    r->c.h = 0.01;
    r->c.contact = r->q, r->c.ncontact = n;
    r->c.sim = &r->sim;
    r->sim.model = &r->model, r->sim.params.mass = r->mass;
    r->c.begun = 1;
    r->e.nv = nv, r->e.h = 0.01;
}

static double energy(rig *r, const double *x, double *grad) {
    double e = 0;
    r->e.x = x, r->e.grad = grad;
    if (grad) memset(grad, 0, 3 * (size_t)r->e.nv * sizeof(double));
    CHECK(clothi_contact_eval(&r->c, &r->e, &e) == CLOTH_OK);
    return e;
}

/* A pair of kind at points x [4 x 3]. */
static void pair_set(rig *r, int at, int kind, int key, double start, double share) {
    clothi_contact *q = r->q + at;
    int             i;
    q->kind = kind, q->a = key, q->b = 7;
    q->slot = -1;
    q->key.cloth = 1, q->key.a = key;
    q->n = q->end = kind == CLOTHI_VP ? 2 : 4;
    for (i = 0; i < q->n; i++) q->v[i] = i;
    q->range = T, q->room = U;
    q->start = start, q->stiffness = 50, q->share = share;
    q->away = clothi_contact_away(&r->c, q);
    q->size = -1, q->scale = 1;
}

/* gradient against differences of the energy; returns the largest component. */
static double gradient(rig *r, double *x, double step, double tolerance) {
    double most = 0, worst = 0;
    int    i;
    (void)energy(r, x, r->grad);
    for (i = 0; i < 3 * r->e.nv; i++) most = fmax(most, fabs(r->grad[i]));
    for (i = 0; i < 3 * r->e.nv; i++) {
        const double old = x[i];
        double       e[4];
        x[i] = old + step, e[0] = energy(r, x, NULL);
        x[i] = old - step, e[1] = energy(r, x, NULL);
        x[i] = old + 2 * step, e[2] = energy(r, x, NULL);
        x[i] = old - 2 * step, e[3] = energy(r, x, NULL);
        x[i] = old;
        e[0] = (8 * (e[0] - e[1]) - (e[2] - e[3])) / (12 * step);
        worst = fmax(worst, fabs(e[0] - r->grad[i]));
    }
    CHECK(worst <= tolerance * most + 1e-13);
    if (!(worst <= tolerance * most + 1e-13)) printf("    %g of %g\n", worst, most);
    return most;
}

static void turn(double u, double v, double w, double *x) {
    const double a = 0.7, b = -0.4, v1 = sin(a) * u + cos(a) * v;
    x[0] = cos(a) * u - sin(a) * v, x[1] = cos(b) * v1 - sin(b) * w;
    x[2] = sin(b) * v1 + cos(b) * w;
}

/* Points of a pair `gap` m apart, turned at will. */
static void pair_place(int kind, double gap, double *x) {
    static const double vf[12] = {0.31, 1, 0.27, 0, 0, 0, 1, 0, 0.1, 0.1, 0, 1};
    static const double ee[12] = {0.2, 1, -0.5, 0.3, 1, 0.6, -0.3, 0, 0.1, 0.7, 0, 0.0};
    int                 i;
    for (i = 0; i < 4; i++) {
        const double *p = (kind == CLOTHI_EE ? ee : vf) + 3 * i;
        turn(0.03 * p[0], gap * p[1], 0.03 * p[2], x + 3 * i);
    }
}

/* E_col of single pairs: weakly and deeply in, with damping towards and away, with a small share
 * and its guard; out of range there is nothing. */
static void differences(void) {
    static const double gap[] = {1.95e-3, 1.5e-3, 1e-3, 7e-4, 5.2e-4, 2.2e-3};
    static const double start[] = {1.9e-3, 1e-3, 6e-4, 5e-3};
    static const double share[] = {1, 0.4, 0};
    double              x[12];
    int                 kind, i, j, k, felt = 0;
    for (kind = CLOTHI_VF; kind <= CLOTHI_EE; kind++)
        for (i = 0; i < 6; i++)
            for (j = 0; j < 4; j++)
                for (k = 0; k < 3; k++) {
                    rig    r;
                    double most;
                    rig_start(&r, 1, 4);
                    pair_set(&r, 0, kind, 0, start[j], share[k]);
                    pair_place(kind, gap[i], x);
                    most = gradient(&r, x, 2e-8, 2e-6);
                    felt += most > 0;
                    if (gap[i] > T && !(start[j] < gap[i])) CHECK(!(most > 0));
                    if (share[k] > 0.9 && gap[i] < 0.9 * fmin(start[j], T)) CHECK(most > 0);
                }
    CHECK(felt > 60);
}

/* A force is K u^2/(t (1 - u/U)^2) and the damping's, along the line between the nearest points. */
static void forces(void) {
    static const double gap[] = {1.9e-3, 1e-3, 5e-4};
    double              x[12], sum, across;
    int                 i, k;
    for (i = 0; i < 3; i++) {
        rig          r;
        const double u = T - gap[i], damp = 50 * 0.02 / 0.01;
        const double s = u / (1 - u / U), want = 50 * s * s / T + damp * (1.95e-3 - gap[i]);
        rig_start(&r, 1, 4);
        pair_set(&r, 0, CLOTHI_VF, 0, 1.95e-3, 1);
        pair_place(CLOTHI_VF, gap[i], x);
        (void)energy(&r, x, r.grad);
        sum = sqrt(clothi_dot3(r.grad, r.grad));
        CHECK_REL(sum, want, 1e-10);
        for (k = 0; k < 3; k++) {           /* nothing from within */
            across = r.grad[k] + r.grad[3 + k] + r.grad[6 + k] + r.grad[9 + k];
            CHECK_NEAR(across, 0, 1e-14 * want);
        }
    }
}

/* Two to four pairs of one feature: the 8-norm of what each has alone, and differences. */
static void joined(void) {
    int n, kind;
    for (n = 2; n <= 4; n++)
        for (kind = CLOTHI_VF; kind <= CLOTHI_EE; kind++) {
            rig         r;
            double      x[3 * MOST], alone[4], E;
            long double sum = 0;
            int         i;
            rig_start(&r, n, 7);
            pair_place(kind, 1.1e-3, x);
            for (i = 4; i < 7; i++)         /* more corners of the second side, a little bent */
                turn(0.03 * (1.3 - 0.6 * (i - 4)), -4e-5 * i, 0.03 * (1 - 0.8 * (i & 1)),
                     x + 3 * i);
            for (i = 0; i < n; i++) {
                pair_set(&r, i, kind, 0, 1.4e-3 + 1e-4 * i, i == 1 ? 0.5 : 1);
                r.q[i].a = i;
                if (kind == CLOTHI_VF) r.q[i].v[1] = i ? 1 + i : 1;
                r.q[i].v[2] = 2 + i, r.q[i].v[3] = 3 + i;
            }
            for (i = 0; i < n; i++) {
                r.c.contact = r.q + i, r.c.ncontact = 1, r.c.framed = 0;
                alone[i] = energy(&r, x, NULL);
                sum += powl((long double)alone[i], 8);
            }
            r.c.contact = r.q, r.c.ncontact = n, r.c.framed = 0;
            E = energy(&r, x, NULL);
            CHECK(E > 0);
            CHECK_REL(E, powl(sum, 1 / 8.0L), 1e-13);
            (void)gradient(&r, x, 2e-8, 5e-6);
            r.q[0].key.b = 5;               /* another key: no more joined */
            r.c.framed = 0;
            CHECK(energy(&r, x, NULL) >= E * (1 - 1e-14));
        }
}

/* --- the Hessian --- */

/* Out of a matrix of nv vertices, by its product. */
static void dense(const cloth_matrix *A, int nv, double *H) {
    double *p = (double *)calloc(3 * (size_t)nv, sizeof(double));
    int     i, j;
    if (!p) exit(2);
    for (j = 0; j < 3 * nv; j++) {
        double y[3 * MOST];
        p[j] = 1;
        cloth_matrix_mul(A, NULL, p, y);
        for (i = 0; i < 3 * nv; i++) H[3 * nv * i + j] = y[i];
        p[j] = 0;
    }
    free(p);
}

/* What a pair puts into the matrix: along the normal exactly the slope, by differences, and
 * nowhere below the exact Hessian, whose curvature across is not positive. */
static void hessian(void) {
    static const int all[4] = {0, 1, 2, 3}, ends[2] = {0, 4};
    cloth_pattern *pattern = NULL;
    cloth_matrix  *A = NULL;
    int            kind, i, j, round;
    CHECK(cloth_pattern_create(NULL, 4, 1, ends, all, NULL, &pattern) == CLOTH_OK);
    CHECK(cloth_matrix_create(NULL, pattern, &A) == CLOTH_OK);
    if (!A) return;
    for (kind = CLOTHI_VF; kind <= CLOTHI_EE; kind++)
        for (round = 0; round < 3; round++) {
            const double gap[3] = {1.6e-3, 1e-3, 5.5e-4}, step = 1e-8;
            double       H[144], F[144], x[12], g1[12], g0[12], n[12], size = 0, along, exact;
            double       least = 0, scale = 0;
            rig          r;
            rig_start(&r, 1, 4);
            pair_set(&r, 0, kind, 0, 1.9e-3, 1);
            pair_place(kind, gap[round], x);
            cloth_matrix_clear(A);
            r.e.hess = A;
            (void)energy(&r, x, r.grad);
            r.e.hess = NULL;
            dense(A, 4, H);
            for (j = 0; j < 12; j++) {
                const double old = x[j];
                x[j] = old + step, (void)energy(&r, x, g1);
                x[j] = old - step, (void)energy(&r, x, g0);
                x[j] = old;
                for (i = 0; i < 12; i++) F[12 * i + j] = (g1[i] - g0[i]) / (2 * step);
            }
            for (i = 0; i < 3; i++)         /* the first side as one, along the normal */
                size += r.grad[i] * r.grad[i];
            memset(n, 0, sizeof n);
            for (i = 0; i < (kind == CLOTHI_EE ? 6 : 3); i++)
                n[i] = r.grad[i % 3] / sqrt(size);
            for (along = exact = 0, i = 0; i < 144; i++) {
                along += n[i / 12] * H[i] * n[i % 12];
                exact += n[i / 12] * F[i] * n[i % 12];
                scale = fmax(scale, fabs(F[i]));
                CHECK_NEAR(H[i], H[12 * (i % 12) + i / 12], 1e-9 * scale);
            }
            CHECK_REL(along, exact, 1e-5);
            for (i = 0; i < 400; i++) {     /* directions: not below the exact one, not negative */
                double p[12], e = 0, m = 0, pp = 0;
                for (j = 0; j < 12; j++) p[j] = sin(1.7 * i * (j + 1) + j), pp += p[j] * p[j];
                for (j = 0; j < 144; j++) {
                    e += p[j / 12] * F[j] * p[j % 12];
                    m += p[j / 12] * H[j] * p[j % 12];
                }
                CHECK(m >= -1e-9 * scale * pp);
                least = fmin(least, (m - e) / (scale * pp));
            }
            CHECK(least > -1e-4);
        }
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(pattern);
}

/* A vertex in a fold of 90 degrees, near to both faces, one key: their distances are linear in it,
 * so that the matrix knows its second derivatives, what couples both distances among them, but for
 * a little that keeps it definite. */
static void fold(void) {
    static const double place[15] = {0,    0,    0,    0,    0,     -0.03, 0,   0,
                                     0.03, 0.05, 0.05, 0,    -0.05, 0.05,  0};
    static const int    all[5] = {0, 1, 2, 3, 4}, ends[2] = {0, 5};
    static const int    face[2][3] = {{1, 2, 3}, {2, 1, 4}};
    static const double gaps[4][2] = {{1e-3, 1e-3}, {1e-3, 1.01e-3}, {7e-4, 6.9e-4},
                                      {1e-3, 1.6e-3}};
    cloth_pattern      *pattern = NULL;
    cloth_matrix       *A = NULL;
    int                 i, j, k;
    CHECK(cloth_pattern_create(NULL, 5, 1, ends, all, NULL, &pattern) == CLOTH_OK);
    CHECK(cloth_matrix_create(NULL, pattern, &A) == CLOTH_OK);
    for (k = 0; k < 4 && A; k++) {
        const double a = gaps[k][0] * sqrt(0.5), b = gaps[k][1] * sqrt(0.5), step = 1e-9;
        double       x[15], g1[15], g0[15], H[225], most = 0;
        rig          r;
        rig_start(&r, 2, 5);
        memcpy(x, place, sizeof x);
        x[0] = b - a, x[1] = a + b;
        for (i = 0; i < 2; i++) {
            pair_set(&r, i, CLOTHI_VF, 0, 1.9e-3, 1);
            r.q[i].b = i;
            memcpy(r.q[i].v + 1, face[i], sizeof face[i]);
        }
        cloth_matrix_clear(A);
        r.e.hess = A;
        (void)energy(&r, x, r.grad);
        r.e.hess = NULL;
        dense(A, 5, H);
        for (i = 0; i < 3; i++) most = fmax(most, H[16 * i]);
        for (j = 0; j < 3; j++) {
            const double old = x[j];
            x[j] = old + step, (void)energy(&r, x, g1);
            x[j] = old - step, (void)energy(&r, x, g0);
            x[j] = old;
            for (i = 0; i < 3; i++)
                CHECK_NEAR(H[15 * i + j], (g1[i] - g0[i]) / (2 * step), 5e-3 * most);
        }
        for (i = 0; i < 400; i++) {
            double m = 0, p[15];
            for (j = 0; j < 15; j++) p[j] = sin(1.7 * i * (j + 1) + j);
            for (j = 0; j < 225; j++) m += p[j / 15] * H[j] * p[j % 15];
            CHECK(m >= -1e-9 * most);
        }
    }
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(pattern);
}

/* --- friction --- */

/* A pair moved u m across and `in` m along its normal, with limit 0.01 N: the gradient is that of
 * the energy for a frame that stays, the force is Coulomb's, K its derivative or a majorizer. */
static void rub(const double *w, int n, double across, double scale_at) {
    static const double normal[3] = {0.6, 0, 0.8}, side[3] = {0.8, 0, -0.6};
    const double        eps = cloth_collide_desc_default().slip, step = 1e-9;
    double              x[12], tangent[3], K[9], u[3], size, expect, unused[9];
    rig                 r;
    clothi_contact     *q = r.q;
    int                 i, j, k;
    rig_start(&r, 1, 4);
    q->n = n, q->range = T, q->room = U, q->limit = 0.01, q->scale = scale_at;
    memcpy(q->normal, normal, sizeof normal);
    q->slip[1] = 4e-6;
    q->carry[1] = -1e-6;
    for (i = 0; i < n; i++) q->v[i] = i, q->w[i] = w[i];
    memset(x, 0, sizeof x);
    for (k = 0; k < 3; k++) x[k] = (across * side[k] + 1e-4 * normal[k]) / w[0];
    (void)clothi_contact_friction(&r.c, q, x, tangent, K);
    for (k = 0; k < 3; k++) u[k] = across * side[k] + (k == 1 ? 3e-6 : 0);
    size = sqrt(clothi_dot3(u, u));
    expect = size < eps ? 0.01 * (2 * size / eps - size * size / (eps * eps)) : 0.01;
    for (k = 0; k < 3; k++) CHECK_NEAR(tangent[k], expect * u[k] / size, 1e-12);
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            const double old = x[3 * i + k];
            double       p1[3], p0[3], e1, e0;
            x[3 * i + k] = old + step, e1 = clothi_contact_friction(&r.c, q, x, p1, unused);
            x[3 * i + k] = old - step, e0 = clothi_contact_friction(&r.c, q, x, p0, unused);
            x[3 * i + k] = old;
            CHECK_NEAR(w[i] * tangent[k], (e1 - e0) / (2 * step), 1e-5 * 0.01);
            for (j = 0; j < 3; j++) {       /* scale 1 takes the curvature along u that it lacks */
                double d = (p1[j] - p0[j]) / (2 * step);
                double more = size < eps ? 1 / (eps * eps) : 1 / (size * size);
                more *= scale_at * 0.01 * u[j] * u[k] / size * w[i];
                CHECK_NEAR(w[i] * K[3 * j + k], d + more, 2e-5 * 0.01 / fmax(size, eps));
            }
        }
}

static void coulomb(void) {
    static const double vf[4] = {1, -0.2, -0.3, -0.5}, ee[4] = {0.3, 0.7, -0.6, -0.4}, vp[1] = {1};
    static const double across[4] = {1e-6, 6e-6, 1.2e-5, 3e-4};     /* sticks, slides */
    int                 i;
    for (i = 0; i < 8; i++) {
        rub(vf, 4, across[i % 4], i / 4);
        rub(ee, 4, across[i % 4], i / 4);
        rub(vp, 1, across[i % 4], i / 4);
    }
}

/* What sticks remembers all of its motion, what slides desc.slip of it; contacts of one key one
 * anchor, by their forces. */
static void anchors(void) {
    rig    r;
    double x[6], eps;
    int    k, round, impact = 0;
    for (round = 0; round < 3; round++) {
        clothi_obstacle ground;
        memset(&ground, 0, sizeof ground);
        rig_start(&r, round == 2 ? 2 : 1, 1);
        r.c.nw = 2;
        r.c.obstacle = &ground, r.c.nobstacle = 1;
        ground.kind = CLOTH_OBSTACLE_PLANE, ground.used = 1, ground.v0 = 1;
        clothi_no_turn(ground.turn), clothi_no_turn(ground.turned);
        eps = r.c.desc.slip;
        for (k = 0; k < r.c.ncontact; k++) {
            clothi_contact *q = r.q + k;
            pair_set(&r, k, CLOTHI_VP, 0, 1e-3, 1);
            q->slot = q->b = 0;
            q->key.cloth = 0;
            q->n = 2;
            q->w[0] = 1, q->w[1] = -1;
            q->normal[1] = 1;
            q->friction = 0.4;
            q->slip[2] = round == 1 ? 3e-4 : 0;
        }
        if (round == 2) r.q[1].slip[2] = 4e-6;
        r.xa[1] = 1e-3;
        x[0] = 6e-6, x[1] = 0.9e-3, x[2] = 0;
        CHECK(clothi_contact_close(&r.c, x, &impact) == CLOTH_OK);
        CHECK(r.c.nnext == 1);
        CHECK(r.c.next[0].force > 0);
        CHECK_REL(r.c.next[0].gap, 0.9e-3, 1e-12);
        CHECK_NEAR(r.c.next[0].slip[1], 0, 1e-18);
        if (round == 0) CHECK_NEAR(r.c.next[0].slip[0], 6e-6, 1e-18);
        if (round == 1) {
            CHECK_REL(sqrt(clothi_dot3(r.c.next[0].slip, r.c.next[0].slip)), eps, 1e-12);
            CHECK_REL(r.c.next[0].slip[2] / r.c.next[0].slip[0], 50, 1e-12);
        }
        if (round == 2) {                   /* two equal forces: the mean slip */
            CHECK_REL(r.c.next[0].slip[2], 2e-6, 1e-12);
            CHECK_REL(r.c.next[0].slip[0], 6e-6, 1e-12);
        }
        CHECK_REL(r.q[0].limit, 0.4 * r.q[0].force, 1e-14);
        clothi_free(NULL, r.c.next);
    }
}

/* --- the normal force backwards --- */

/* What a contact has by its gap at x^n, as clothi_contact_new() makes it. */
static void begins(const cloth_collide *c, clothi_contact *q, double start) {
    double left;
    q->start = start;
    q->room = q->range - clothi_pair_pole(c, q->range, start);
    q->away = clothi_contact_away(c, q);
    left = clothi_max(q->range - start - q->away, 0);
    q->base = clothi_elastic_energy(q, q->range - q->away) +
              0.5 * clothi_contact_damping(c, q) * left * left;
}

/* Energy, force and guard, as `by` weighs them, of a contact of this gap, gap at x^n and share. */
static double normal_at(const cloth_collide *c, clothi_contact q, const double *at,
                        const double *by) {
    clothi_frame f;
    begins(c, &q, at[1]);
    f.gap = at[0], q.share = at[2];
    clothi_contact_normal(c, &q, 1, &f);
    return by[0] * f.energy + by[1] * f.force + by[2] * f.own[1];
}

/* By gap, start (which moves the pole and where damping ends, where it begins near) and share. */
static void normal_backwards(void) {
    unsigned long long seed = 7;
    double             worst = 0;
    int                n, k, poles = 0, damped = 0, guarded = 0;
    for (n = 0; n < 2000; n++) {
        cloth_collide  c;
        clothi_contact q;
        clothi_rates   b;
        double         at[3], by[3], said[3], t = 2e-3;
        memset(&c, 0, sizeof c), memset(&q, 0, sizeof q), memset(&b, 0, sizeof b);
        c.h = 1.0 / 60, c.approach = CLOTHI_APPROACH;
        c.desc.relaxation = n % 3 ? 0.02 : 0;
        q.range = t, q.stiffness = 40;
        at[1] = ref_uniform(&seed, 0.02, 1.3) * t;
        at[2] = n % 2 ? ref_uniform(&seed, 0.2, 0.9) : 1;
        q.share = at[2];
        begins(&c, &q, at[1]);
        q.gap = at[0] = t - q.away - ref_uniform(&seed, 0.05, 0.95) * (q.room - q.away);
        for (k = 0; k < 3; k++) by[k] = ref_uniform(&seed, -1, 1);
        by[0] *= 1 / t;
        clothi_back_normal(&c, &q, by[0], by[1], by[2], &b);
        said[0] = b.gap, said[1] = b.start, said[2] = b.share;
        poles += c.approach * q.start < CLOTHI_POLE * t, damped += q.away > 0;
        guarded += q.share < 1 && t - q.gap > (1 - CLOTHI_GUARD) * q.room;
        for (k = 0; k < 3; k++) {
            const double eps = 1e-6 * (k < 2 ? t : 1), here = at[k];
            double       up, is, size;
            if (k == 2 && !(at[2] < 1)) continue;
            at[k] = here + eps, up = normal_at(&c, q, at, by);
            at[k] = here - eps, is = (up - normal_at(&c, q, at, by)) / (2 * eps);
            at[k] = here, size = fabs(is) + fabs(said[k]) + 1e-3 * q.stiffness;
            worst = fmax(worst, fabs(is - said[k]) / size);
        }
    }
    printf("  backwards: %d near the pole, %d damped, %d guarded: off by %.1e\n", poles, damped,
           guarded, worst);
    CHECK(poles > 100 && damped > 100 && guarded > 20);
    CHECK(worst < 1e-5);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(barrier);
    RUN(differences);
    RUN(forces);
    RUN(joined);
    RUN(hessian);
    RUN(fold);
    RUN(coulomb);
    RUN(anchors);
    RUN(normal_backwards);
    return TEST_END();
}
