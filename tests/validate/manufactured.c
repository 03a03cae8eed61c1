/* manufactured.c - a membrane under the body force that makes a chosen shape its equilibrium.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. \
 *      validate/manufactured.c -lm
 *
 *   x = s (X, Y, 0) + (a sin pi X sin pi Y, b sin pi X sin 2 pi Y, c sin pi X sin pi Y)
 *   f = -Div P,  P = F S,  S = lambda tr(E) I + 2 mu E      (StVK, plane stress, Y h = 1)
 *
 * on the unit square with its boundary held. f is computed here from second derivatives of x and
 * checked against the table (s = 1). The solves stretch the sheet by s > 1, so that it is in
 * tension everywhere: where it is compressed the shape is an equilibrium but no minimum. */
#include "statics.h"

static const double pi = 3.14159265358979323846;

typedef struct shape { double s, a, b, c, nu; } shape;

static const shape shapes[] = {
    {1.2, 0.05, 0.03, 0.1, 0.3}, {1.2, 0.02, -0.02, 0.4, 0.45}, {1.5, 0.1, 0.05, 0.25, 0},
};

/* a, b, c, nu, X, Y, then f[3] and W of the table, s = 1. */
static const double samples[][10] = {
    {0.05, 0.03, 0.1, 0.3, 1.0 / 6, 1.0 / 6, -0.012491425656407, 0.38085452016613,
     7.4858961071407e-05, 0.012531050116549},
    {0.05, 0.03, 0.1, 0.3, 1.0 / 3, 1.0 / 6, 0.36143701372668, 1.3778705389808, 0.32514710894174,
     0.017249244478881},
    {0.05, 0.03, 0.1, 0.3, 0.5, 1.0 / 6, 0.63346508391238, 1.9157493586147, 0.53484412708461,
     0.015103441237663},
};

/* Position, first derivatives F [3 x 2] and second derivatives G [3 x 3]: XX, XY, YY. */
static void kinematics(const shape *p, double X, double Y, double *x, double *F, double *G) {
    const double q[3] = {p->a, p->b, p->c};
    int          i;
    for (i = 0; i < 3; i++) {
        const double ky = (i == 1 ? 2 : 1) * pi;
        const double sx = sin(pi * X), cx = cos(pi * X), sy = sin(ky * Y), cy = cos(ky * Y);
        x[i] = q[i] * sx * sy + (i == 0 ? p->s * X : i == 1 ? p->s * Y : 0);
        F[2 * i] = q[i] * pi * cx * sy + (i == 0 ? p->s : 0);
        F[2 * i + 1] = q[i] * ky * sx * cy + (i == 1 ? p->s : 0);
        G[3 * i] = -q[i] * pi * pi * sx * sy;
        G[3 * i + 1] = q[i] * pi * ky * cx * cy;
        G[3 * i + 2] = -q[i] * ky * ky * sx * sy;
    }
}

/* Returns W, and f [3]; *least: the smaller principal value of S. */
static double body_force(const shape *p, double X, double Y, double *f, double *least) {
    const double mu = 1 / (2 * (1 + p->nu)), lambda = p->nu / (1 - p->nu * p->nu);
    double       x[3], F[6], G[9], E[3] = {-0.5, 0, -0.5}, S[3], tr;
    int          i, j, k;
    kinematics(p, X, Y, x, F, G);
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) E[k] += 0.5 * F[2 * i + k / 2] * F[2 * i + (k + 1) / 2];
    tr = E[0] + E[2];
    for (k = 0; k < 3; k++) S[k] = 2 * mu * E[k] + (k == 1 ? 0 : lambda * tr);
    for (k = 0; k < 3; k++) f[k] = 0;
    for (j = 0; j < 2; j++) {               /* f -= d(P column j)/dX_j                         */
        double dE[3] = {0, 0, 0}, dS[3];
        for (i = 0; i < 3; i++)
            for (k = 0; k < 3; k++) {
                const int r = k / 2, c = (k + 1) / 2;
                dE[k] += 0.5 * (G[3 * i + r + j] * F[2 * i + c] + F[2 * i + r] * G[3 * i + c + j]);
            }
        for (k = 0; k < 3; k++) dS[k] = 2 * mu * dE[k] + (k == 1 ? 0 : lambda * (dE[0] + dE[2]));
        for (i = 0; i < 3; i++)
            f[i] -= G[3 * i + j] * S[j] + G[3 * i + 1 + j] * S[1 + j] + F[2 * i] * dS[j]
                    + F[2 * i + 1] * dS[1 + j];
    }
    *least = 0.5 * (S[0] + S[2]) - sqrt(0.25 * (S[0] - S[2]) * (S[0] - S[2]) + S[1] * S[1]);
    return mu * (E[0] * E[0] + 2 * E[1] * E[1] + E[2] * E[2]) + 0.5 * lambda * tr * tr;
}

/* Gauss's rule of three points on each of 32 x 32 squares: terms like sin(pi Y) are not periodic on
 * [0, 1], so the midpoint rule would stop at 1e-5. *least: the smallest stress found. */
static double total_energy(const shape *p, double *least) {
    static const double node[3] = {0.11270166537925831, 0.5, 0.88729833462074169};
    static const double weight[3] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    const int n = 32;
    double    sum = 0, f[3], low;
    int       i, j;
    *least = 1e300;
    for (i = 0; i < 3 * n; i++)
        for (j = 0; j < 3 * n; j++) {
            sum += body_force(p, (i / 3 + node[i % 3]) / n, (j / 3 + node[j % 3]) / n, f, &low) *
                   weight[i % 3] * weight[j % 3] / (n * n);
            *least = fmin(*least, low);
        }
    return sum;
}

static void force_against_the_table(void) {
    table  t = table_read("refdata/mms_membrane.csv");
    double worst = 0, worst_total = 0, f[3], low;
    int    k, i, rows = t.rows ? t.rows : (int)(sizeof samples / sizeof *samples);
    for (k = 0; k < rows; k++) {
        const double *r = t.rows ? t.at + k * t.columns : samples[k];
        const double *at = t.rows ? r + 7 : r + 4, *force = t.rows ? r + 18 : r + 6;
        shape         p = {1, 0, 0, 0, 0};
        double        W;
        p.a = r[0];
        p.b = r[1];
        p.c = r[2];
        p.nu = t.rows ? r[4] : r[3];
        W = body_force(&p, at[0], at[1], f, &low);
        for (i = 0; i < 3; i++) worst = fmax(worst, fabs(f[i] - force[i]));
        worst = fmax(worst, fabs(W - (t.rows ? r[21] : r[9])));
        if (t.rows && k % 25 == 0)
            worst_total = fmax(worst_total, fabs(total_energy(&p, &low) / r[22] - 1));
    }
    printf("  f and W at %d points of the table: %.1e", rows, worst);
    if (t.rows) printf("; total energy %.1e", worst_total);
    printf("\n");
    CHECK(worst <= 1e-12);
    CHECK(worst_total <= 1e-9);
    table_free(&t);
}

/* Root mean square position error and energy error with n edges a side. */
static int solve(const shape *p, int n, double jitter, double energy, double *l2, double *de) {
    unsigned long long seed = 17;
    double            *force, *start, x[3], F[6], G[9], sum = 0, least;
    cloth_ledger       ledger;
    scene              s;
    int                i, k, good;
    scene_sheet(&s, CLOTH_SHEET_ALTERNATING, n + 1, n + 1, 1, 1);
    scene_material(&s, 1, 1, p->nu, 0);
    s.desc.bend = CLOTH_BEND_NONE;
    s.desc.tolerance = 1e-11;
    force = (double *)calloc(3 * (size_t)s.mesh->nv, sizeof *force);
    start = (double *)calloc(3 * (size_t)s.mesh->nv, sizeof *start);
    for (i = 0; i < s.mesh->nv; i++) {      /* sheet (x, z) = (X, -Y)                          */
        const int c = i % (n + 1), r = i / (n + 1), rim = c == 0 || c == n || r == 0 || r == n;
        double   *q = s.mesh->x + 3 * i;
        for (k = 0; k < 3 && !rim; k += 2) q[k] += ref_uniform(&seed, -jitter, jitter) / n;
        kinematics(p, q[0], q[2], x, F, G);
        for (k = 0; k < 3; k++) start[3 * i + k] = x[k];
        if (rim) scene_pin(&s, i, CLOTH_AXIS_ALL);
    }
    s.desc.x = start;
    s.desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    good = scene_start(&s);
    if (good) {
        const double *mass = cloth_sim_params(s.sim)->mass;     /* area / 3 of each triangle   */
        for (i = 0; i < s.mesh->nv; i++) {
            body_force(p, s.mesh->x[3 * i], s.mesh->x[3 * i + 2], force + 3 * i, &least);
            for (k = 0; k < 3; k++) force[3 * i + k] *= mass[i];
        }
        CHECK(cloth_sim_set_force(s.sim, force) == CLOTH_OK);
        good = scene_solve(&s);
        for (i = 0; i < 3 * s.mesh->nv; i++) {
            const double d = scene_x(&s)[i] - start[i];
            sum += mass[i / 3] * d * d;
        }
        *l2 = sqrt(sum);
        CHECK(cloth_sim_energy(s.sim, &ledger) == CLOTH_OK);
        *de = ledger.stretch / energy - 1;
    }
    scene_end(&s);
    free(force);
    free(start);
    return good;
}

static void convergence(void) {
    int k, m, c;
    printf("  a     b     c     nu    s    mesh         n   L2 error  order   energy     order\n");
    for (k = 0; k < 3; k++)
        for (m = 0; m < 2; m++) {
            const shape *p = shapes + k;
            double       least, energy = total_energy(p, &least), l2, de, last = 0, last_e = 0;
            CHECK(least > 0);
            for (c = 0; c < (test_full() ? 5 : 3); c++) {
                const int n = 8 << c;
                if (!solve(p, n, m ? 0.2 : 0, energy, &l2, &de)) break;
                printf("  %-5.2f %-5.2f %-5.2f %-5.2f %-4.1f %-10s %3d  %.3e", p->a, p->b, p->c,
                       p->nu, p->s, m ? "jittered" : "regular", n, l2);
                if (c) printf("  %.2f  ", order_of(last, l2));
                else printf("        ");
                printf("%10.2e", de);
                if (c) printf("  %.2f", order_of(last_e, de));
                printf("\n");
                if (c > 1) CHECK(order_of(last, l2) > 1.8 && order_of(last, l2) < 2.2);
                if (c > 1 && !m) CHECK(order_of(last_e, de) > 1.9 && order_of(last_e, de) < 2.1);
                if (c == 2) CHECK(fabs(de) <= 1e-3);
                last = l2;
                last_e = de;
            }
        }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(force_against_the_table);
    RUN(convergence);
    return TEST_END();
}
