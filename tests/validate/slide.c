/* slide.c - friction and depth of contact as a user gets them: at the default tolerance.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/slide.c -lm
 *
 *   slide    a sheet on an incline of 30 degrees, from rest, 1 s: acceleration
 *            g (sin a - mu cos a), in n steps of implicit Euler acc h^2 n (n+1)/2. Laid down at
 *            the gap that it rests at, where the first step of the contact is the first of the
 *            slide, and pressed down for 0.5 s before
 *   stick    mu >= tan a: within 1 mm in that second
 *   depth    whatever the law of the force: at rest it sums to the weight, the gap is between the
 *            separation t/4 and the range t and less under twice the load. As documented, with the
 *            force k (t - g)^2/t on each vertex, k = stiffness x its share of the area:
 *                g = t - sqrt(t weight / k)
 *   decay    half the load is taken away; each vertex goes up as the scalar equation says, solved
 *            here by bisection for each step of implicit Euler:
 *                m (g - 2 g1 + g2) / h^2 = max(0, k (t - g)^2/t - k tau (g - g1)/h) - load */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

#define PI 3.14159265358979323846

/* Way down the slope, m, in n steps of h, from `gap` m above the ground; mesh: squares of the
 * ground, 0 a plane; pressed: for 0.5 s before. */
static double slide(double part, int mesh, double gap, int pressed_down, double h, int n) {
    const double a = 30 * PI / 180, mu = part * tan(a), c = cos(a), z = sin(a);
    double       down[3] = {0, -FRIC_G, 0}, in[3] = {0, 0, 0}, way = NAN, x0, y0;
    fric         s;
    int          i;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    s.desc.tolerance = cloth_desc_default().tolerance;
    fric_place(&s, a, (1 - 0.4) * c - z * gap, (1 - 0.4) * z + c * gap, 0.45);
    in[0] = FRIC_G * z, in[1] = -FRIC_G * c;
    if (!fric_start(&s) || !CHECK(fric_ground(&s, a, mu, mesh, 0.17) == CLOTH_OK)) goto done;
    if (pressed_down) {
        CHECK(cloth_sim_set_gravity(s.sim, in) == CLOTH_OK);
        for (i = 0; i < 0.5 / h; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
        CHECK(cloth_sim_set_gravity(s.sim, down) == CLOTH_OK);
    }
    x0 = fric_mean(&s, cloth_sim_state(s.sim)->x, 0);
    y0 = fric_mean(&s, cloth_sim_state(s.sim)->x, 1);
    for (i = 0; i < n; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
    way = -c * (fric_mean(&s, cloth_sim_state(s.sim)->x, 0) - x0)
        - z * (fric_mean(&s, cloth_sim_state(s.sim)->x, 1) - y0);
done:
    fric_end(&s);
    return way;
}

/* --- depth --- */

/* The documented law: force on a vertex of a share of the area with k = stiffness x area, N. */
static double law(double k, double gap, double speed) {
    const double tau = cloth_collide_desc_default().relaxation;
    return gap < FRIC_T ? fmax(0, k * (FRIC_T - gap) * (FRIC_T - gap) / FRIC_T - k * tau * speed)
                        : 0;
}

static double rest_gap(double k, double load) { return FRIC_T - sqrt(FRIC_T * load / k); }

typedef struct bed {                        /* of a sheet on a plane under g times its weight  */
    double gap, spread, force;              /* m, mean and largest less smallest; of the weight */
} bed;

static void measure(const fric *s, double load, bed *out) {
    const double *x = cloth_sim_state(s->sim)->x;
    double       *f = (double *)calloc(3 * (size_t)s->nv, sizeof(double)), lo = 1, hi = -1;
    int           i;
    if (!f) exit(2);
    CHECK(cloth_collide_forces(s->contact, f) == CLOTH_OK);
    for (i = 0; i < s->nv; i++) lo = fmin(lo, x[3 * i + 1]), hi = fmax(hi, x[3 * i + 1]);
    out->gap = fric_mean(s, x, 1);
    out->spread = hi - lo;
    out->force = s->nv * fric_mean(s, f, 1) / load;
    free(f);
}

/* load_a for 1 s and then load_b for n steps, in g; path [n] m: mean height, may be NULL. */
static void press(double stiffness, double load_a, double load_b, double h, int n, bed *a, bed *b,
                  double *path) {
    const double weight = 0.2 * 0.01 * FRIC_G;
    double       g[3] = {0, 0, 0};
    fric         s;
    int          i;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    fric_place(&s, 0, 0, FRIC_T / 2, 0);
    s.collide.stiffness = stiffness;
    if (fric_start(&s) && CHECK(fric_ground(&s, 0, 0.3, 0, 0) == CLOTH_OK)) {
        g[1] = -load_a * FRIC_G;
        CHECK(cloth_sim_set_gravity(s.sim, g) == CLOTH_OK);
        for (i = 0; i < 1 / h; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
        measure(&s, load_a * weight, a);
        g[1] = -load_b * FRIC_G;
        CHECK(cloth_sim_set_gravity(s.sim, g) == CLOTH_OK);
        for (i = 0; i < n; i++) {
            CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
            if (path) path[i] = fric_mean(&s, cloth_sim_state(s.sim)->x, 1);
        }
        measure(&s, load_b * weight, b);
    }
    fric_end(&s);
}

/* What must hold whatever the law: the force carries the weight, the gap lies in the range. */
static void weight(void) {
    static const double load[] = {0.2, 1, 3};
    double              last = FRIC_T;
    bed                 a, b;
    int                 i;
    printf("  load g  force/weight       gap/t  uneven/t (default stiffness)\n");
    for (i = 0; i < 3; i++) {
        press(0, load[i], load[i], 1.0 / 60, 30, &a, &b, NULL);
        printf("  %6.1f %13.6f %11.4f %9.1e\n", load[i], b.force, b.gap / FRIC_T,
               b.spread / FRIC_T);
        CHECK_NEAR(b.force, 1, 0.01);
        CHECK(b.gap > FRIC_T / 4 && b.gap < FRIC_T && b.gap < last);
        CHECK(b.spread < 0.01 * FRIC_T);
        last = b.gap;
    }
}

static void depth(void) {
    static const double part[] = {0.02, 0.08, 0.18};    /* of what holds it at g = 0 */
    double              worst = 0;
    int                 i;
    printf("  load/k t    gap/t    closed form   error of t - g\n");
    for (i = 0; i < 3; i++) {
        const double weight = 0.2 * FRIC_G, k = weight / (part[i] * FRIC_T);    /* of 1 m^2 */
        const double ref = rest_gap(k, weight);
        bed          a, b;
        press(k, 1, 1, 1.0 / 60, 1, &a, &b, NULL);
        printf("  %8.2f %8.5f %14.5f   %.1e\n", part[i], b.gap / FRIC_T, ref / FRIC_T,
               (b.gap - ref) / (FRIC_T - ref));
        worst = fmax(worst, fabs((b.gap - ref) / (FRIC_T - ref)));
    }
    OPEN_MOST(worst, 0.01, "depth at rest, error in parts");
}

/* Height after n steps of implicit Euler from rest under `before`, then under `load`; of 1 m^2. */
static double decayed(double k, double mass, double before, double load, double h, int n) {
    double g1 = rest_gap(k, before), g2 = g1, lo, hi, mid;
    int    i, j;
    for (i = 0; i < n; i++) {
        for (lo = 0, hi = 2 * FRIC_T, j = 0; j < 60; j++) {     /* the excess rises with g */
            mid = 0.5 * (lo + hi);
            if (mass * (mid - 2 * g1 + g2) / (h * h) + load < law(k, mid, (mid - g1) / h)) lo = mid;
            else hi = mid;
        }
        g2 = g1, g1 = lo;
    }
    return g1;
}

static void decay(void) {
    static const double hs[] = {1.0 / 60, 1.0 / 240};
    const double        load = 0.2 * FRIC_G, k = load / (0.16 * FRIC_T);        /* of 1 m^2 */
    const double        from = rest_gap(k, load), to = rest_gap(k, load / 2);
    double              path[24], worst = 0;
    bed                 a, b;
    int                 i, j;
    printf("    h s   time s  risen/way   scalar equation\n");
    for (i = 0; i < 2; i++) {
        press(k, 1, 0.5, hs[i], 24, &a, &b, path);
        for (j = 0; j < 24; j++) {
            const double ref = decayed(k, 0.2, load, load / 2, hs[i], j + 1);
            if (j % 6 == 5) printf("  %6.4f %7.4f %10.5f %16.5f\n", hs[i], (j + 1) * hs[i],
                                   (path[j] - from) / (to - from), (ref - from) / (to - from));
            worst = fmax(worst, fabs(path[j] - ref) / (to - from));
        }
    }
    OPEN_MOST(worst, 0.01, "rise under half the load, error in parts of the way");
}

/* --- sliding and sticking --- */

static void coulomb(int pressed_down) {
    static const double part[] = {0.5, 0.8, 0.9, 0.95, 0.99, 1.01, 1.05, 1.2, 2};
    const double        h = 1.0 / 60;
    double              worst = 0, still = 0;
    const int           n = 60;
    bed                 a, b;
    int                 k, mesh;
    press(0, cos(30 * PI / 180), cos(30 * PI / 180), h, 1, &a, &b, NULL);
    printf("  ground mu/tan a     way m  Coulomb's m   error\n");
    for (mesh = 0; mesh <= 6; mesh += 6)
        for (k = 0; k < 9; k++) {
            const double acc = FRIC_G * sin(30 * PI / 180) * fmax(0, 1 - part[k]);
            const double ref = acc * h * h * 0.5 * n * (n + 1);
            const double way = slide(part[k], mesh, b.gap, pressed_down, h, n);
            if (ref > 0) printf("  %-6s %8.2f %9.6f %12.6f  %.4f\n", mesh ? "mesh" : "plane",
                                part[k], way, ref, way / ref - 1);
            else printf("  %-6s %8.2f %9.6f       sticks\n", mesh ? "mesh" : "plane", part[k], way);
            if (ref > 0) worst = fmax(worst, fabs(way / ref - 1));
            else still = fmax(still, fabs(way));
            CHECK(way == way);
        }
    OPEN_MOST(worst, 0.03, "way that slides, error in parts");
    OPEN_MOST(still, 1e-3, "way that sticks, m");
}

static void laid(void) { coulomb(0); }
static void pressed(void) { coulomb(1); }

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(laid);
    RUN(pressed);
    RUN(weight);
    RUN(depth);
    RUN(decay);
    return TEST_END();
}
