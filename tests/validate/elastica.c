/* elastica.c - a strip that is clamped level and bends under its weight: the heavy elastica.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. validate/elastica.c -lm
 *
 *   theta'' = -Gamma (1 - s) cos theta,  theta(0) = 0,  theta'(1) = 0,  Gamma = rho g L^3/D
 *
 * Rows of the strip are tied, so that it bends as a cylinder: n segments and n hinges, each of
 * moment (D b/l) theta. The clamp is two pinned rows; the hinge between clamp and strip counts
 * half a segment, so its stiffness is doubled (params.hinge_scale = 2), else the error is of order
 * one in 1/n. The strip can stretch, the reference cannot: this leaves Gamma D/(2 Yh L^2). A stiff
 * membrane lets Newton turn a segment by no more than about (Gamma D/(Yh L^2))^(1/3) an iteration,
 * so it is stiffened in stages, each from the equilibrium of the one before. */
#include "statics.h"

typedef struct tip { double gamma, x, y; } tip;

/* The continuum and the chain of n = 10, 20, 40 hinges. */
static const tip continuum[] = {
    {1, 0.9912463953, 0.1234714020},   {10, 0.6563537612, 0.7001997155},
    {20, 0.4452320522, 0.8298814434},  {50, 0.2450147563, 0.9079171235},
    {100, 0.1592233826, 0.9375239354},
};
typedef struct chain_tip { double gamma; int n, half; double x, y; } chain_tip;
static const chain_tip chain[] = {
    {10, 10, 0, 0.5927606908397, 0.7668780292364}, {10, 20, 0, 0.6243978959717, 0.7349566507096},
    {10, 40, 0, 0.6403552329364, 0.7179236845910}, {10, 10, 1, 0.6537021072925, 0.7053651161012},
    {10, 20, 1, 0.6557010895609, 0.7014916144954}, {10, 40, 1, 0.6561912420794, 0.7005226898137},
};

#define STIFF 1e9                           /* Yh L^2/D of the last stage: 1e3, 1e5, 1e7, 1e9   */

static int solve_in_stages(scene *s, double first, double last) {
    cloth_material m = s->desc.material;
    for (m.membrane = first; m.membrane < 1.01 * last; m.membrane *= 100) {
        CHECK(cloth_sim_set_material(s->sim, 0, &m) == CLOTH_OK);
        if (!scene_solve(s)) return 0;
    }
    return 1;
}

/* L = 1, D = 1, rho = 1: Gamma = g. Rows -1 .. n across z; row i at x = i/n. */
static int strip(double gamma, int n, int half, tip *out) {
    const int ny = 3, nx = n + 2;
    scene     s;
    int       i, j, k, good;
    scene_sheet(&s, CLOTH_SHEET_DIAGONAL, nx, ny, 1 + 1.0 / n, 2.0 / n);
    scene_material(&s, 1, STIFF, 0, 1);
    s.desc.gravity[1] = -gamma;
    s.desc.tolerance = 1e-9;
    for (j = 0; j < ny; j++)
        for (i = 0; i < nx; i++) {
            scene_pin(&s, j * nx + i, i < 2 ? CLOTH_AXIS_ALL : CLOTH_AXIS_Z);
            if (i >= 2 && j > 0) scene_tie(&s, i, j * nx + i, CLOTH_AXIS_X | CLOTH_AXIS_Y);
        }
    good = scene_start(&s);
    if (good && half) {
        const cloth_topology *t = cloth_model_topology(s.model);
        cloth_params         *p = cloth_sim_params(s.sim);
        for (k = 0; k < t->nh; k++)
            if (t->hinges[4 * k] % nx == 1 && t->hinges[4 * k + 1] % nx == 1)
                p->hinge_scale[k] = 2;
        CHECK(cloth_sim_params_changed(s.sim) == CLOTH_OK);
    }
    if (good) good = solve_in_stages(&s, 1e3, STIFF);
    out->gamma = gamma;
    out->x = good ? scene_x(&s)[3 * (nx - 1)] - 1.0 / n : 0;
    out->y = good ? -scene_x(&s)[3 * (nx - 1) + 1] : 0;
    scene_end(&s);
    return good;
}

static void against_the_continuum(void) {
    static const int n[3] = {10, 20, 40};
    int k, i;
    printf("    Gamma   n     tip x/L    tip y/L    error x    error y  order\n");
    for (k = 0; k < (int)(sizeof continuum / sizeof *continuum); k++) {
        double last = 0;
        for (i = 0; i < 3; i++) {
            tip    a;
            double ex, ey, e;
            if (!strip(continuum[k].gamma, n[i], 1, &a)) return;
            ex = a.x - continuum[k].x;
            ey = a.y - continuum[k].y;
            e = sqrt(ex * ex + ey * ey);
            printf("  %7.4g %3d  %.8f %.8f %10.2e %10.2e", a.gamma, n[i], a.x, a.y, ex, ey);
            if (i) printf("   %.2f", order_of(last, e));
            printf("\n");
            if (i) CHECK(order_of(last, e) > 1.9 && order_of(last, e) < 2.1);
            if (i == 2) CHECK(e <= 1e-3);
            last = e;
        }
    }
}

/* Bound: the extension, Gamma/(2 Yh) when the strip hangs straight, and the solver's tolerance. */
static void compare_chain(double gamma, int n, int half, double x, double y) {
    const double bound = 0.55 * gamma / STIFF + 2e-9;
    tip          a;
    if (!strip(gamma, n, half, &a)) return;
    printf("  %7.4g %3d %-9s %.10f %.10f %10.2e %10.2e  (bound %.1e)\n", gamma, n,
           half ? "half-dual" : "full row", a.x, a.y, a.x - x, a.y - y, bound);
    CHECK_NEAR(a.x, x, bound);
    CHECK_NEAR(a.y, y, bound);
}

static void against_the_chain(void) {
    table t = table_read("refdata/elastica_discrete.csv");
    int   k;
    printf("    Gamma   n clamp      tip x/L      tip y/L         error x    error y\n");
    for (k = 0; t.rows == 0 && k < (int)(sizeof chain / sizeof *chain); k++)
        compare_chain(chain[k].gamma, chain[k].n, chain[k].half, chain[k].x, chain[k].y);
    for (k = 0; k < t.rows; k++) {
        const double *r = t.at + k * t.columns;
        const int     half = strstr(t.line[k], "half_dual") != NULL;
        if (r[0] >= 1000 && r[1] < 10) continue;    /* more than one equilibrium               */
        if (!test_full() && (r[0] > 100 || r[0] < 10 || r[1] > 20 || r[1] < 10)) continue;
        compare_chain(r[0], (int)r[1], half, r[3], r[4]);
    }
    table_free(&t);
}

/* Nothing tied: an equilateral sheet, 32 rows across, clamped over a = 1/(n + 1/2). Columns of
 * vertices are a/2 apart and a hinge spans four of them, so the first that can bend covers the
 * column before the last pinned one: there the strip of length 1 begins. The sheet bends as a
 * cylinder but for its edge rows (D is 0.35 % low) and its free sides, sqrt(12 D/Yh) wide. */
static void wide_sheet(void) {
    const int    n = test_full() ? 56 : 36, ny = 33;
    const double a = 1 / (n + 0.5), gamma = 10, x = 0.6563537612, y = 0.7001997155;
    double       tip_x = 0, tip_y = 0;
    int          i, count = 0;
    scene        s;
    scene_sheet(&s, CLOTH_SHEET_EQUILATERAL, n + 2, ny, (n + 1) * a, (ny - 1) * a * sqrt(0.75));
    scene_material(&s, 1, 1e6, 0, 1);
    s.desc.gravity[1] = -gamma;
    s.desc.tolerance = 1e-6;
    for (i = 0; i < s.mesh->nv; i++)
        if (s.mesh->x[3 * i] < 1.01 * a) scene_pin(&s, i, CLOTH_AXIS_ALL);
    if (scene_start(&s) && solve_in_stages(&s, 1e4, 1e6)) {
        for (i = 0; i < s.mesh->nv; i++)
            if (s.mesh->x[3 * i] > (n + 0.99) * a) {
                tip_x += scene_x(&s)[3 * i] - a / 2;
                tip_y -= scene_x(&s)[3 * i + 1];
                count++;
            }
        tip_x /= count;
        tip_y /= count;
        printf("  equilateral sheet %d x %d, Gamma 10: tip %.5f %.5f, error %.2e %.2e, %d it\n", n,
               ny - 1, tip_x, tip_y, tip_x - x, tip_y - y, s.report.newton);
        CHECK(fabs(tip_x - x) <= 0.005 && fabs(tip_y - y) <= 0.005);
    }
    scene_end(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(against_the_continuum);
    RUN(against_the_chain);
    RUN(wide_sheet);
    return TEST_END();
}
