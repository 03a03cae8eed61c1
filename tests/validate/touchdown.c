/* touchdown.c - where a strip leaves what it lies on: raised by its edge; bent double between
 * plates.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/touchdown.c -lm
 *
 *   raised      A heavy strip on a floor, one edge held up by d, free to turn. Over the length l
 *               that is in the air D w'''' = -q; where it touches down w = w' = w'' = 0, and the
 *               floor bears q l/2 in a line:
 *                  w = q (2 l x^3 - x^4)/(24 D),  l = (24 D d/q)^(1/4),  floor: q (L - l/2)
 *   bent double The elastica between plates that are H apart, frictionless, each pushing by F
 *               where the strip leaves it, there straight. With theta from one plate to the other:
 *                  D theta'^2/2 = F sin theta,  H = B sqrt(D/(2 F)),  B = integral of sqrt(sin)
 *                  over [0, pi],  so  F H^2/D = B^2/2  and  H times the largest curvature = B
 *               [the two-point bend test of glass fibres, where the curvature is called 2.396/H]
 *
 * Rows are tied, so that the strip bends as a cylinder; steps of implicit Euler until it rests.
 * Forces are read from cloth_collide_wrench(). q and F are per metre of width. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "statics.h"

#define WIDTH 0.1
#define B 2.396280469471184                 /* sqrt(pi) Gamma(3/4)/Gamma(5/4)                  */

typedef void place_fn(double s, double *x); /* where the point s m along the strip begins      */

/* A strip of 1 m, n segments along x, and its contact. */
static int begin(scene *s, int n, double D, double thickness, double stiffness, place_fn *place,
                 cloth_collide **contact) {
    cloth_collide_desc d = cloth_collide_desc_default();
    double            *x;
    int                i, v, good;
    scene_sheet(s, CLOTH_SHEET_DIAGONAL, n + 1, 3, 1, WIDTH);
    scene_material(s, 1, 1e6 * D, 0, D);
    s->desc.tolerance = 1e-9;
    s->desc.contact = CLOTH_CONTACT_OBSTACLES;
    s->desc.x = x = (double *)malloc(3 * (size_t)s->mesh->nv * sizeof *x);
    for (v = 0; v < s->mesh->nv; v++) {
        i = v % (n + 1);
        memcpy(x + 3 * v, s->mesh->x + 3 * v, 3 * sizeof *x);
        place(s->mesh->x[3 * i], x + 3 * v);
        scene_pin(s, v, CLOTH_AXIS_Z);
        if (v != i) scene_tie(s, i, v, CLOTH_AXIS_X | CLOTH_AXIS_Y);
    }
    d.thickness = thickness, d.stiffness = stiffness;
    good = scene_start(s) && CHECK(cloth_collide_create(s->sim, &d, contact) == CLOTH_OK);
    s->desc.x = NULL;
    free(x);
    return good;
}

static cloth_obstacle plate(cloth_collide *contact, double y, double up) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id = {0};
    double              point[3] = {0, 0, 0};
    point[1] = y;
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = point, o.friction = 0;
    o.normal[0] = o.normal[2] = 0, o.normal[1] = up;
    CHECK(cloth_collide_add(contact, &o, &id) == CLOTH_OK);
    return id;
}

static void wrench(cloth_collide *contact, cloth_obstacle id, double *force, double *torque) {
    CHECK(cloth_collide_wrench(contact, id, NULL, force, torque) == CLOTH_OK);
}

static void flat(double s, double *x) { (void)s, (void)x; }

static void raise_by(scene *s, int n, double y) {
    int j;
    for (j = 0; j < 3; j++) {
        const int v = j * (n + 1) + n;
        double    to[3];
        memcpy(to, scene_x(s) + 3 * v, sizeof to);
        to[1] = y;
        CHECK(cloth_sim_pin(s->sim, v, CLOTH_AXIS_Y | CLOTH_AXIS_Z, to) == CLOTH_OK);
    }
}

static void raised_by(double d) {
    const int      n = 50;
    const double   gravity[3] = {0, -1, 0};      /* density 1 kg/m^2                          */
    const double   D = 0.25, q = 1, l = sqrt(sqrt(24 * D * d / q)), t = 1e-4;
    const double   floor_force = q * (1 - 0.5 * l), arm = q * (0.5 - 0.5 * l) / floor_force;
    cloth_collide *contact = NULL;
    cloth_obstacle ground;
    scene          s;
    double         f[3], torque[3], error[2], rest, off = 0;
    int            i;
    if (!begin(&s, n, D, t, 1e7, flat, &contact)) goto done;
    ground = plate(contact, -t, 1);
    CHECK(cloth_sim_set_gravity(s.sim, gravity) == CLOTH_OK);
    for (i = 0; i < 20; i++) CHECK(cloth_step(s.sim, 0.1, NULL) == CLOTH_OK);
    rest = scene_x(&s)[1];
    for (i = 1; i <= 80; i++) {
        raise_by(&s, n, rest + d * (i < 20 ? i / 20.0 : 1));
        if (!CHECK(cloth_step(s.sim, 0.5, &s.report) == CLOTH_OK)) goto done;
    }
    for (i = 0; i <= n; i++) {
        const double *p = scene_x(&s) + 3 * i, x = fmax(p[0] - (1 - l), 0);
        off = fmax(off, fabs(p[1] - rest - q * x * x * x * (2 * l - x) / (24 * D)));
    }
    wrench(contact, ground, f, torque);
    error[0] = fabs(-f[1] / WIDTH / floor_force - 1);
    error[1] = fabs(torque[2] / f[1] / arm - 1);
    printf("  raised %.3f m: l %.4f, floor bears %.6f N/m (%.6f) at %.5f m (%.5f), shape off by"
           " %.1e m, relative error %.1e\n", d, l, -f[1] / WIDTH, floor_force, torque[2] / f[1],
           arm, off, fmax(error[0], error[1]));
    CHECK(error[0] < 3e-4 && error[1] < 3e-4);
    CHECK(off < 2e-3 * d);
done:
    cloth_collide_destroy(contact);
    scene_end(&s);
}

static void raised(void) {
    raised_by(0.01);
    raised_by(0.003);
}

/* A half circle and two legs, inside of plates that are 0.25 m apart. */
static void hairpin(double s, double *x) {
    const double r = 0.125 - 5e-4, leg = 0.5 * (1 - 3.141592653589793 * r), a = (s - leg) / r;
    x[0] = s < leg ? s : s > 1 - leg ? 1 - s : leg + r * sin(a);
    x[1] = s < leg ? -r : s > 1 - leg ? r : -r * cos(a);
}

/* Turn of the strip at vertex i, rad. */
static double turn(const double *x, int i) {
    const double *p = x + 3 * i;
    const double  a[2] = {p[0] - p[-3], p[1] - p[-2]}, b[2] = {p[3] - p[0], p[4] - p[1]};
    return atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
}

/* Returns the relative error of F. */
static double bent_double_by(int n) {
    cloth_collide *contact = NULL;
    cloth_obstacle low, high;
    scene          s;
    double         f[3], g[3], torque[3], bottom = 1, top = -1, curl = 0, H, error = 1;
    int            i;
    if (!begin(&s, n, 1, 1e-3, 1e9, hairpin, &contact)) goto done;
    low = plate(contact, -0.125, 1);
    high = plate(contact, 0.125, -1);
    for (i = 0; i < 100; i++)
        if (!CHECK(cloth_step(s.sim, i < 50 ? 0.01 : 1, &s.report) == CLOTH_OK)) goto done;
    for (i = 0; i <= n; i++) {
        bottom = fmin(bottom, scene_x(&s)[3 * i + 1]);
        top = fmax(top, scene_x(&s)[3 * i + 1]);
        if (i > 0 && i < n) curl = fmax(curl, n * turn(scene_x(&s), i));
    }
    H = top - bottom;
    wrench(contact, low, f, torque);
    wrench(contact, high, g, torque);
    error = fabs(-f[1] / WIDTH * H * H / (0.5 * B * B) - 1);
    printf("  bent double, n %3d: F H^2/D %.5f (%.5f), H times curvature %.5f (%.5f), relative"
           " errors %.1e %.1e\n", n, -f[1] / WIDTH * H * H, 0.5 * B * B, H * curl, B, error,
           fabs(H * curl / B - 1));
    CHECK_NEAR(f[1], -g[1], 1e-6 * g[1]);
    CHECK(error < 0.4 / n && fabs(H * curl / B - 1) < 0.25 / n);
done:
    cloth_collide_destroy(contact);
    scene_end(&s);
    return error;
}

static void bent_double(void) {
    const double coarse = bent_double_by(50), fine = bent_double_by(100);
    CHECK(fine < 0.5 * coarse);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(raised);
    RUN(bent_double);
    return TEST_END();
}
