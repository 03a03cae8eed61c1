/* catenary.c - a heavy stretchable strip that hangs between two level supports.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. validate/catenary.c -lm
 *
 *   T(s)^2 = H^2 + q^2 (s - 1/2)^2,   l (l^2 - 1)/2 = T,   span = int l H/T ds,
 *   sag = int_0^(1/2) l q (1/2 - s)/T ds        (rho, g, L = 1; T, H over Y h; no bending)
 *
 * Rows are tied: the mesh is a chain of n segments with nodes of weight q/n, whose equilibrium is
 * found here on its own, by bisection for H; it tends to the catenary as 1/n^2. */
#include "statics.h"

typedef struct row { double q, span, H, sag; } row;
static const row rows[] = {
    {0.001, 0.95, 0.0008437642851090897, 0.13714500997526274},
    {0.01, 0.5, 0.0011434748816731794, 0.39980462120247784},
    {0.01, 1.0, 0.01599075900551371, 0.07756811813012644},
    {0.1, 0.8, 0.030145830569595886, 0.29412377749428054},
    {0.1, 1.1, 0.1422672544805873, 0.09579192071789029},
    {1.0, 0.95, 0.281785149731946, 0.37629227751469607},
};

/* Stretch under the tension T: l^3 - l = 2 T, l >= 1. */
static double stretch(double T) {
    double l = 1 + cbrt(2 * T);
    int    k;
    for (k = 0; k < 60; k++) l -= (l * l * l - l - 2 * T) / (3 * l * l - 1);
    return l;
}

/* Span of the chain at horizontal force H, and its sag. */
static double chain_span(int n, double q, double H, double *sag) {
    double span = 0;
    int    i;
    *sag = 0;
    for (i = 0; i < n; i++) {
        const double V = q * (i + 0.5 - 0.5 * n) / n, T = sqrt(H * H + V * V), l = stretch(T) / n;
        span += l * H / T;
        if (V < 0) *sag -= l * V / T;
    }
    return span;
}

static double chain_force(int n, double q, double span, double *sag) {
    double low = 0, high = 10;
    int    k;
    for (k = 0; k < 200; k++) {
        const double H = 0.5 * (low + high);
        if (chain_span(n, q, H, sag) < span) low = H;
        else high = H;
    }
    return 0.5 * (low + high);
}

/* The strip along x, gravity along -y, a support at each end. The start is a parabola. */
static int hang(int n, double q, double span, double *H, double *sag) {
    const int nx = n + 1, ny = 3;
    double   *start, *grad;
    int       i, j, good;
    scene     s;
    scene_sheet(&s, CLOTH_SHEET_DIAGONAL, nx, ny, 1, 2.0 / n);
    scene_material(&s, 1, 1, 0, 0);
    s.desc.bend = CLOTH_BEND_NONE;
    s.desc.gravity[1] = -q;
    s.desc.tolerance = 1e-11;
    start = (double *)malloc((size_t)s.mesh->nv * 3 * sizeof *start);
    grad = (double *)malloc((size_t)s.mesh->nv * 3 * sizeof *grad);
    memcpy(start, s.mesh->x, (size_t)s.mesh->nv * 3 * sizeof *start);
    for (j = 0; j < ny; j++)
        for (i = 0; i < nx; i++) {
            const double t = (double)i / n, deep = span < 1 ? sqrt(6 * span * (1 - span)) : 0.2;
            double      *x = start + 3 * (j * nx + i);
            x[0] = span * (t - 0.5);
            x[1] = -deep * t * (1 - t);
            scene_pin(&s, j * nx + i, i == 0 || i == n ? CLOTH_AXIS_ALL : CLOTH_AXIS_Z);
            if (j > 0 && i > 0 && i < n)
                scene_tie(&s, i, j * nx + i, CLOTH_AXIS_X | CLOTH_AXIS_Y);
        }
    s.desc.x = start;
    good = scene_start(&s) && scene_solve(&s);
    if (good) {
        double energy;
        CHECK(cloth_sim_potential(s.sim, scene_x(&s), &energy, grad) == CLOTH_OK);
        for (*H = 0, j = 0; j < ny; j++) *H -= grad[3 * j * nx] / (2.0 / n);
        *sag = -scene_x(&s)[3 * (n / 2) + 1];
    }
    scene_end(&s);
    free(start);
    free(grad);
    return good;
}

static void compare(double q, double span, double H_ref, double sag_ref) {
    double last = 0;
    int    c;
    for (c = 0; c < 3; c++) {
        const int n = 10 << c;
        double    H, sag, chain_H, chain_sag, e;
        if (!hang(n, q, span, &H, &sag)) return;
        chain_H = chain_force(n, q, span, &chain_sag);
        e = fabs(sag - sag_ref) + fabs(H - H_ref) / H_ref;
        printf("  %5.3g %5.3g %3d  %.9f %.9f  %9.1e %9.1e %10.1e %9.1e", q, span, n, sag, H,
               sag - chain_sag, H - chain_H, sag - sag_ref, H - H_ref);
        if (c) printf("  %.2f", order_of(last, e));
        printf("\n");
        CHECK_NEAR(sag, chain_sag, 1e-9);
        CHECK_NEAR(H, chain_H, 1e-9 * q);
        if (c) CHECK(order_of(last, e) > 1.8 && order_of(last, e) < 2.2);
        last = e;
    }
}

static void against_chain_and_catenary(void) {
    table t = table_read("refdata/catenary_stvk.csv");
    int   k;
    printf("      q  span   n  sag         H/Yh         to the chain: sag, H   to the catenary"
           "     order\n");
    for (k = 0; t.rows == 0 && k < (int)(sizeof rows / sizeof *rows); k++)
        compare(rows[k].q, rows[k].span, rows[k].H, rows[k].sag);
    for (k = 0; k < t.rows; k++) {
        const double *r = t.at + k * t.columns;
        compare(r[0], r[1], r[2], r[3]);
    }
    table_free(&t);
}

/* A host's spring of stiffness 0.05 and length 0 between the last vertices of two far rows, both
 * of them followers: its Hessian must reach the leaders. */
typedef struct far_spring { int v[2]; } far_spring;

static cloth_status far_eval(void *user, const cloth_eval *e, double *energy) {
    const far_spring *q = (const far_spring *)user;
    double            x[6], g[6], H[36];
    int               k;
    memcpy(x, e->x + 3 * q->v[0], 3 * sizeof *x);
    memcpy(x + 3, e->x + 3 * q->v[1], 3 * sizeof *x);
    *energy = cloth_spring(x, 0, 0.05, g, H, 0);
    for (k = 0; e->grad && k < 6; k++) e->grad[3 * q->v[k / 3] + k % 3] += g[k];
    return e->hess ? cloth_matrix_add_element(e->hess, 2, q->v, H) : CLOTH_OK;
}

static void far_coupling(void) {
    const int  n = 20, nx = n + 1;
    far_spring q;
    cloth_term term;
    scene      s;
    int        i, j;
    memset(&term, 0, sizeof term);
    q.v[0] = nx + 5;
    q.v[1] = nx + 15;
    term.name = "far spring";
    term.user = &q;
    term.eval = far_eval;
    scene_sheet(&s, CLOTH_SHEET_DIAGONAL, nx, 2, 1, 1.0 / n);
    scene_material(&s, 1, 1, 0, 0);
    s.desc.bend = CLOTH_BEND_NONE;
    s.desc.gravity[1] = -0.1;
    for (j = 0; j < 2; j++)
        for (i = 0; i < nx; i++) {
            scene_pin(&s, j * nx + i, i == 0 || i == n ? CLOTH_AXIS_ALL : CLOTH_AXIS_Z);
            if (j > 0 && i > 0 && i < n) scene_tie(&s, i, nx + i, CLOTH_AXIS_X | CLOTH_AXIS_Y);
        }
    if (scene_start(&s)) {
        CHECK(cloth_sim_add_term(s.sim, &term) == CLOTH_OK);
        if (scene_solve(&s)) {
            printf("  far spring on tied rows: %d iterations, last update %.1e m\n",
                   s.report.newton, s.report.residual_m);
            CHECK(s.report.newton <= 20);     /* 29 where the coupling stays with the followers  */
        }
    }
    scene_end(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(against_chain_and_catenary);
    RUN(far_coupling);
    return TEST_END();
}
