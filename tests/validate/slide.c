/* slide.c - friction and depth of contact as a user gets them: at the default tolerance.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/slide.c -lm
 *
 *   slide    a sheet on an incline of 30 degrees, from rest, 1 s: acceleration
 *            g (sin a - mu cos a), in n steps of implicit Euler acc h^2 n (n+1)/2. Laid down at
 *            the gap that it rests at, where the first step of the contact is the first of the
 *            slide, and pressed down by g for 0.5 s before: until it has risen N is larger, and
 *            so is friction
 *   stick    mu >= tan a: within 1 mm in that second
 *   depth    at rest the potential carries the weight, each vertex its own: with u = t - g,
 *            U = t - pole and k = stiffness x area
 *                k u^2/(t (1 - u/U)^2) = w      so      u = s/(1 + s/U),  s = sqrt(w t/k)
 *            the pole is t/4, or 0.98 of where what is nearer began its last step
 *   decay    half the load is taken away; each vertex goes up as the scalar equation says, solved
 *            here by bisection for each step of implicit Euler:
 *                m (g - 2 g1 + g2) / h^2 = max(0, force(g) - k tau (g - g1)/h) - w
 *   factor   what is d off the rest is, after steps that change the force by its slope,
 *                kappa = h^2/m 2 k u/(t (1 - z)^3),  z = u/U,      gamma = h tau k/m,
 *                (1 + kappa + gamma) d - (2 + gamma) d1 + d2 = 0
 *            with roots of product p = 1/(1 + kappa + gamma) and sum s = (2 + gamma) p: without
 *            relaxation an oscillation that sqrt(p) shrinks in a step, else two decays */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

#define PI 3.14159265358979323846

/* Mesh of 12 x 12 squares of 0.17 m from -0.17 m on, along the slope: the sheet goes from 1.6 m to
 * 0.35 at most. */
#define GROUND 0.17
#define START  1.6

/* Way down the slope, m, in n steps of h, from `gap` m above the ground; mesh: squares of the
 * ground, 0 a plane; pressed: for 0.5 s before. */
static double slide(double part, int mesh, double gap, int pressed_down, double h, int n) {
    const double a = 30 * PI / 180, mu = part * tan(a), c = cos(a), z = sin(a);
    double       down[3] = {0, -FRIC_G, 0}, in[3] = {0, 0, 0}, way = NAN, x0, y0;
    fric         s;
    int          i;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    s.desc.tolerance = cloth_desc_default().tolerance;
    fric_place(&s, a, START * c - z * gap, START * z + c * gap, 0.45);
    in[0] = FRIC_G * z, in[1] = -FRIC_G * c;
    if (!fric_start(&s) || !CHECK(fric_ground(&s, a, mu, mesh, GROUND) == CLOTH_OK)) goto done;
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

static const double room = (1 - 0.25) * FRIC_T;      /* U: from the range to the pole, m */

/* Force on a vertex with k = stiffness x its share of the area, N; it rises at `speed`. */
static double law(double k, double tau, double gap, double speed) {
    const double u = FRIC_T - gap, s = u / (1 - u / room);
    return u > 0 ? fmax(0, k * s * s / FRIC_T - k * tau * speed) : 0;
}

static double rest_gap(double k, double load) {
    const double s = sqrt(load * FRIC_T / k);
    return FRIC_T - s / (1 + s / room);
}

typedef struct bed {                        /* of a sheet at rest under g times its weight     */
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

typedef struct bedding {
    double stiffness, tau;                  /* Pa/m, 0: the default; s                         */
    int    mesh;                            /* squares of the ground, 0 a plane                */
    double load_a, load_b;                  /* g, for 2 s and for n steps of h                 */
    double h;                               /* s                                               */
    int    n;
} bedding;

/* path [n] m: mean height, may be NULL. No vertex is within t of an edge of the mesh. */
static void press(const bedding *p, bed *a, bed *b, double *path) {
    const double weight = 0.2 * 0.01 * FRIC_G;
    double       g[3] = {0, 0, 0};
    fric         s;
    int          i;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    fric_place(&s, 0, 0.013, FRIC_T / 2, 0.003);
    s.collide.stiffness = p->stiffness;
    s.collide.relaxation = p->tau;
    if (fric_start(&s) && CHECK(fric_ground(&s, 0, 0.3, p->mesh, GROUND) == CLOTH_OK)) {
        g[1] = -p->load_a * FRIC_G;
        CHECK(cloth_sim_set_gravity(s.sim, g) == CLOTH_OK);
        for (i = 0; i < 2 / p->h; i++) CHECK(cloth_step(s.sim, p->h, NULL) == CLOTH_OK);
        measure(&s, p->load_a * weight, a);
        g[1] = -p->load_b * FRIC_G;
        CHECK(cloth_sim_set_gravity(s.sim, g) == CLOTH_OK);
        for (i = 0; i < p->n; i++) {
            CHECK(cloth_step(s.sim, p->h, NULL) == CLOTH_OK);
            if (path) path[i] = fric_mean(&s, cloth_sim_state(s.sim)->x, 1);
        }
        measure(&s, p->load_b * weight, b);
    }
    fric_end(&s);
}

static bedding bedding_of(double stiffness, double load_a, double load_b, double h, int n) {
    bedding p;
    p.stiffness = stiffness, p.tau = cloth_collide_desc_default().relaxation;
    p.mesh = 0;
    p.load_a = load_a, p.load_b = load_b;
    p.h = h, p.n = n;
    return p;
}

/* What must hold whatever the law: the force carries the weight, the gap lies in the range. */
static void weight(void) {
    static const double load[] = {0.2, 1, 3};
    double              last = FRIC_T;
    bed                 a, b;
    int                 i;
    printf("  load g  force/weight       gap/t  uneven/t (default stiffness)\n");
    for (i = 0; i < 3; i++) {
        const bedding p = bedding_of(0, load[i], load[i], 1.0 / 60, 30);
        press(&p, &a, &b, NULL);
        printf("  %6.1f %13.6f %11.4f %9.1e\n", load[i], b.force, b.gap / FRIC_T,
               b.spread / FRIC_T);
        CHECK_NEAR(b.force, 1, 0.01);
        CHECK(b.gap > FRIC_T / 4 && b.gap < FRIC_T && b.gap < last);
        CHECK(b.spread < 0.01 * FRIC_T);
        last = b.gap;
    }
}

/* By default a force of 30 times the weight at t/2, k/(4 t) without the pole's part: the load is
 * k t/120. On a flat mesh a vertex has one face alone, and the law is that on the plane. */
static void depth(void) {
    static const double part[] = {1.0 / 120, 0.02, 0.08, 0.18};     /* weight / (k t) */
    double              worst = 0;
    int                 i, j, mesh;
    printf("  ground load/k t    gap/t    closed form   error of t - g\n");
    for (mesh = 0; mesh <= 12; mesh += 12)
        for (i = 0; i < 4; i++)
            for (j = 1; j <= 10; j += 9) {
                const double weight = 0.2 * FRIC_G, k = weight / (part[i] * FRIC_T);    /* 1 m^2 */
                const double ref = rest_gap(k, j * weight);
                bedding      p = bedding_of(i ? k : 0, j, j, 1.0 / 60, 1);
                bed          a, b;
                p.mesh = mesh;
                press(&p, &a, &b, NULL);
                printf("  %-6s %8.4f %8.5f %14.5f   %.1e\n", mesh ? "mesh" : "plane", j * part[i],
                       b.gap / FRIC_T, ref / FRIC_T, (b.gap - ref) / (FRIC_T - ref));
                worst = fmax(worst, fabs((b.gap - ref) / (FRIC_T - ref)));
            }
    CHECK(worst <= 0.01);
}

/* Height after n steps of implicit Euler from rest under `before`, then under `load`; of 1 m^2. */
static double decayed(double k, double mass, double before, double load, double h, int n) {
    const double tau = cloth_collide_desc_default().relaxation;
    double       g1 = rest_gap(k, before), g2 = g1, lo, hi, mid;
    int          i, j;
    for (i = 0; i < n; i++) {               /* the excess rises with g from the pole on */
        for (lo = FRIC_T - room, hi = 2 * FRIC_T, j = 0; j < 60; j++) {
            mid = 0.5 * (lo + hi);
            if (mass * (mid - 2 * g1 + g2) / (h * h) + load < law(k, tau, mid, (mid - g1) / h))
                lo = mid;
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
        const bedding p = bedding_of(k, 1, 0.5, hs[i], 24);
        press(&p, &a, &b, path);
        for (j = 0; j < 24; j++) {
            const double ref = decayed(k, 0.2, load, load / 2, hs[i], j + 1);
            if (j % 6 == 5) printf("  %6.4f %7.4f %10.5f %16.5f\n", hs[i], (j + 1) * hs[i],
                                   (path[j] - from) / (to - from), (ref - from) / (to - from));
            worst = fmax(worst, fabs(path[j] - ref) / (to - from));
        }
    }
    CHECK(worst <= 0.01);
}

/* s and p of d = s d1 - p d2 that fit d [n] best: the squares of what is left are least. */
static void fit(const double *d, int n, double *s, double *p) {
    double aa = 0, ab = 0, bb = 0, ac = 0, bc = 0;
    int    i;
    for (i = 2; i < n; i++) {
        aa += d[i - 1] * d[i - 1], ab += d[i - 1] * d[i - 2], bb += d[i - 2] * d[i - 2];
        ac += d[i - 1] * d[i], bc += d[i - 2] * d[i];
    }
    *s = (ac * bb - bc * ab) / (aa * bb - ab * ab);
    *p = (ac * ab - bc * aa) / (aa * bb - ab * ab);
}

/* The load falls by 0.02 %: a motion about the rest under what is left. */
static void factor(void) {
    static const double hs[] = {1.0 / 60, 1.0 / 240, 1.0 / 960}, less = 0.9998;
    const double        weight = 0.2 * FRIC_G, k = weight / (0.02 * FRIC_T);    /* of 1 m^2 */
    double              d[26], worst = 0;
    int                 i, j, load, damped;
    printf("  load   h s  tau s   product of roots            sum\n");
    for (load = 1; load <= 10; load += 9)
        for (damped = 0; damped < 2; damped++)
            for (i = 0; i < 3; i++) {
                const double w = less * load * weight, from = rest_gap(k, load * weight);
                const double to = rest_gap(k, w), u = FRIC_T - to, z = u / room, h = hs[i];
                bedding      m = bedding_of(k, load, less * load, h, 24);
                const double tau = m.tau *= damped;
                const double slope = 2 * k * u / (FRIC_T * pow(1 - z, 3));
                const double kappa = h * h * slope / 0.2, gamma = h * tau * k / 0.2;
                double       s, p;
                bed          a, b;
                press(&m, &a, &b, d + 2);
                d[0] = d[1] = from - to;    /* at rest under the load that was */
                for (j = 2; j < 26; j++) d[j] -= to;
                fit(d, 26, &s, &p);
                printf("  %4d %6.4f %5.2f  %8.5f %8.5f  %8.5f %8.5f\n", load, h, tau, p,
                       1 / (1 + kappa + gamma), s, (2 + gamma) / (1 + kappa + gamma));
                worst = fmax(worst, fabs(p * (1 + kappa + gamma) - 1));
                worst = fmax(worst, fabs(s * (1 + kappa + gamma) / (2 + gamma) - 1));
            }
    CHECK(worst <= 0.01);
}

/* --- sliding and sticking --- */

static void coulomb(int pressed_down) {
    static const double part[] = {0.5, 0.8, 0.9, 0.95, 0.99, 1.01, 1.05, 1.2, 2};
    const double        h = 1.0 / 60;
    double              worst = 0, still = 0;
    const int           n = 60;
    const bedding       lie = bedding_of(0, cos(30 * PI / 180), cos(30 * PI / 180), h, 1);
    bed                 a, b;
    int                 k, mesh;
    press(&lie, &a, &b, NULL);
    printf("  ground mu/tan a     way m  Coulomb's m   error\n");
    for (mesh = 0; mesh <= 12; mesh += 12)
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
    CHECK(worst <= 0.03);
    CHECK(still <= 1e-3);
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
    RUN(factor);
    return TEST_END();
}
