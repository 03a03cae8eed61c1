/* test_friction.c - E_col and friction of sticking and sliding touches against differences.
 *   cc -std=c99 -O2 -ffp-contract=off -I. test_friction.c -lm
 */
#define CLOTHSIM_IMPLEMENTATION
#include "../clothsim_collide.h"

#include "test.h"

/* A touch of 4 cloth vertices with weights w, moved u m across and `in` m along its normal. */
static void compare(const double *w, int n, double across, double in, double ease) {
    static const double normal[3] = {0.6, 0, 0.8}, side[3] = {0.8, 0, -0.6};
    double        size, eps, u[3];
    double        xa[12] = {0}, x[12], pull[3], K[9], grad[12], hess[144], e0, e1, d, scale = 0;
    const double  step = 1e-9;
    cloth_collide c;
    clothi_touch  q;
    int           i, j, k;
    memset(&c, 0, sizeof c);
    memset(&q, 0, sizeof q);
    c.desc = cloth_collide_desc_default();
    c.nv = 4, c.xa = xa, c.h = 0.01;
    q.n = n, q.gap = 1.2e-3, q.range = 2e-3, q.stiffness = 50, q.limit = 0.01;
    q.ease = ease;
    memcpy(q.normal, normal, sizeof normal);
    q.slip[1] = 4e-6;
    for (i = 0; i < n; i++) q.v[i] = i, q.w[i] = w[i];
    q.rest = clothi_touch_rest(&c, &q);
    memset(x, 0, sizeof x);
    for (k = 0; k < 3; k++) x[k] = (across * side[k] + in * normal[k]) / w[0];
    (void)clothi_touch_eval(&c, &q, x, pull, K);
    for (k = 0; k < 3; k++) u[k] = across * side[k] + q.slip[k];
    size = sqrt(clothi_dot3(u, u)), eps = c.desc.slip;
    for (k = 0; k < 9; k++)                 /* ease of what the majorizer has too much */
        K[k] -= ease * q.limit * (size < eps ? 1 / (eps * eps) : 1 / (size * size)) * u[k / 3] *
                u[k % 3] / size;
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            grad[3 * i + k] = w[i] * pull[k];
            for (j = 0; j < 3 * n; j++)
                hess[(3 * i + k) * 12 + j] = w[i] * w[j / 3] * K[3 * k + j % 3];
        }
    for (i = 0; i < 9; i++) scale = fmax(scale, fabs(K[i]));
    for (i = 0; i < 3 * n; i++) {
        double p0[3], p1[3], unused[9];
        const double old = x[i];
        x[i] = old + step, e1 = clothi_touch_eval(&c, &q, x, p1, unused);
        x[i] = old - step, e0 = clothi_touch_eval(&c, &q, x, p0, unused);
        x[i] = old;
        d = (e1 - e0) / (2 * step);
        CHECK_NEAR(grad[i], d, 1e-5 * (0.01 + fabs(d)));
        for (j = 0; j < 3 * n; j++) {
            d = w[j / 3] * (p1[j % 3] - p0[j % 3]) / (2 * step);
            CHECK_NEAR(hess[j * 12 + i], d, 1e-5 * scale);
        }
    }
}

static void differences(void) {
    static const double vf[4] = {1, -0.2, -0.3, -0.5}, ee[4] = {0.3, 0.7, -0.6, -0.4}, vp[1] = {1};
    static const double across[3] = {3e-6, 1.2e-5, 3e-4};   /* sticks, sticks, slides */
    int                 i;
    for (i = 0; i < 9; i++) {
        const double u = across[i % 3], ease = 0.5 * (i / 3);   /* 0: exact */
        compare(vf, 4, u, -1e-4, ease);
        compare(ee, 4, u, 5e-5, ease);
        compare(vp, 1, u, -3e-4, ease);
        compare(vf, 4, u, 2e-3, ease);      /* out of range: friction alone */
    }
}

/* What sticks remembers all of its motion, what slides desc.slip of it. */
static void anchors(void) {
    double        xa[3] = {0, 0, 0}, x[3] = {1e-5, 3e-4, 0};
    cloth_collide c;
    clothi_touch  q;
    clothi_anchor a;
    memset(&c, 0, sizeof c);
    memset(&q, 0, sizeof q);
    memset(&a, 0, sizeof a);
    c.desc = cloth_collide_desc_default();
    c.nv = 1, c.xa = xa, c.h = 0.01;
    q.n = 1, q.w[0] = 1, q.normal[1] = 1;
    clothi_anchor_slip(&c, &q, x, &a);
    CHECK(a.sliding == 0 && fabs(a.slip[0] - 1e-5) < 1e-18 && fabs(a.slip[1]) < 1e-18);
    q.slip[2] = 3e-4;
    clothi_anchor_slip(&c, &q, x, &a);
    CHECK(a.sliding == 1);
    CHECK_REL(sqrt(clothi_dot3(a.slip, a.slip)), c.desc.slip, 1e-12);
    CHECK_REL(a.slip[2] / a.slip[0], 30, 1e-12);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(differences);
    RUN(anchors);
    return TEST_END();
}
