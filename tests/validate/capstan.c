/* capstan.c - a strip over a fixed cylinder holds and slips on either side of T2 = T1 exp(mu phi).
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/capstan.c -lm
 *
 *          ___
 *        /     \        phi: angle of wrap, here pi and pi/2
 *       |   o   |       T1: held with, N, at one end    T2: pulled with, at the other
 *       |       |
 *      T1      T2       dT = mu T dphi along the arc: T2/T1 = exp(mu phi) (Euler, Eytelwein)
 *
 * A pull above the threshold takes the strip away within a second (0.1 N on 2 g), one below leaves
 * the held end where it is: 3 % above and below. FULL=1 finds the threshold by bisection. No
 * gravity. The strip's bending is 1e-7 N m: its moment is D w/R, against T1 R 1e-5 of it. A polygon
 * of n edges in the arc differs by (mu phi)^3/(12 n^2). */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

#define CAPSTAN_R    0.05                   /* m, of the cylinder and half of the thickness */
#define CAPSTAN_TAIL 0.06                   /* m, free at either end */
#define CAPSTAN_HOLD 1.0                    /* N */
#define CAPSTAN_EDGE 4e-3                   /* m */
#define PI           3.14159265358979323846

/* A point of the strip's middle line at arc length s from where it leaves the ground of T1: up
 * along the tangent, around by phi, along the other tangent. */
static void capstan_place(double s, double phi, double *x, double *y) {
    double turn = s < CAPSTAN_TAIL ? 0 : fmin((s - CAPSTAN_TAIL) / CAPSTAN_R, phi);
    double rest = s < CAPSTAN_TAIL ? s - CAPSTAN_TAIL : s - CAPSTAN_TAIL - turn * CAPSTAN_R;
    *x = -CAPSTAN_R * cos(turn) + rest * sin(turn);
    *y = CAPSTAN_R * sin(turn) + rest * cos(turn);
}

/* Forces of both ends, spread over their rows; f [nv x 3] N. */
static void capstan_pull(const fric *s, double phi, double hold, double pull, double *f) {
    int i, k, rows = 0;
    double end = 0;
    for (i = 0; i < s->nv; i++) end = fmax(end, s->mesh->x[3 * i]);
    for (i = 0; i < s->nv; i++) rows += s->mesh->x[3 * i] > end - 1e-9;
    for (i = 0; i < s->nv; i++) {
        const double u = s->mesh->x[3 * i];
        for (k = 0; k < 3; k++) f[3 * i + k] = 0;
        if (u < 1e-9) f[3 * i + 1] = -hold / rows;
        if (u > end - 1e-9) {
            f[3 * i] = pull / rows * sin(phi);
            f[3 * i + 1] = pull / rows * cos(phi);
        }
    }
}

/* Mean height of the held end in m. */
static double capstan_held(const fric *s) {
    double sum = 0;
    int    i, rows = 0;
    for (i = 0; i < s->nv; i++)
        if (s->mesh->x[3 * i] < 1e-9) {
            sum += cloth_sim_state(s->sim)->x[3 * i + 1];
            rows++;
        }
    return sum / rows;
}

/* The strip wrapped by phi around a cylinder of friction mu. */
static int capstan_start(fric *s, double phi, double mu) {
    const double        width = 0.02, length = phi * CAPSTAN_R + 2 * CAPSTAN_TAIL;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double              axis[6] = {0, 0, -0.1, 0, 0, 0.1};
    int                 i;
    fric_sheet(s, 1 + (int)(length / CAPSTAN_EDGE + 0.5), 3, length, width);
    for (i = 0; i < s->nv; i++) {
        capstan_place(s->mesh->x[3 * i], phi, &s->x[3 * i], &s->x[3 * i + 1]);
        s->x[3 * i + 2] = s->mesh->x[3 * i + 2] + 0.5 * width;
    }
    s->desc.material.membrane = 1e4;
    s->desc.material.bending = 1e-7;
    s->desc.material.damping = 0.01;
    s->desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    s->desc.gravity[1] = 0;
    s->desc.tolerance = 1e-7;               /* stalled when friction had the majorizer only */
    o.kind = CLOTH_OBSTACLE_CAPSULE, o.x = axis, o.friction = mu;
    o.radius = CAPSTAN_R - FRIC_T / 2;
    return fric_start(s) && CHECK(cloth_collide_add(s->contact, &o, NULL) == CLOTH_OK);
}

static int capstan_steps, capstan_newton;

/* Way in m of the held end: half a second with the same force at both ends, a second in which the
 * pull grows to `ratio` T1, and one more. */
static double capstan_way(double phi, double mu, double ratio) {
    const double h = 1.0 / 60;
    double       way = NAN, start = 0, *f = NULL;
    cloth_report r;
    fric         s;
    int          step;
    if (!capstan_start(&s, phi, mu)) goto done;
    f = (double *)malloc(3 * (size_t)s.nv * sizeof(double));
    if (!f) goto done;
    for (step = 1; step <= 150; step++) {
        const double part = fmax(0, fmin((step - 30) * h, 1));
        capstan_pull(&s, phi, CAPSTAN_HOLD, CAPSTAN_HOLD * (1 + (ratio - 1) * part), f);
        CHECK(cloth_sim_set_force(s.sim, f) == CLOTH_OK);
        if (!CHECK(cloth_step(s.sim, h, &r) == CLOTH_OK)) goto done;
        capstan_steps++, capstan_newton += r.newton;
        if (step == 30) start = capstan_held(&s);
        way = step < 30 ? 0 : capstan_held(&s) - start;
        if (way > 0.01) break;                          /* it runs */
    }
done:
    free(f);
    fric_end(&s);
    return way;
}

static void threshold(void) {
    static const double wraps[] = {0.5 * PI, PI}, mus[] = {0.2, 0.5};
    const double        room = test_full() ? 0.06 : 0.03;
    const int           halvings = test_full() ? 3 : 0;
    int                 w, m, i;
    printf("  wrap rad    mu  holds at T2/T1   slips at  exp(mu phi)     error of the middle\n");
    for (w = 0; w < 2; w++)
        for (m = 0; m < 2; m++) {
            const double ref = exp(mus[m] * wraps[w]);
            double       low = (1 - room) * ref, high = (1 + room) * ref, way;
            CHECK(capstan_way(wraps[w], mus[m], low) < 0.003);
            way = capstan_way(wraps[w], mus[m], high);
            OPEN(way > 0.01, "way %.4g m with the pull %.0f %% over what slips, wrap %.4g, mu %.2g "
                 "(over 0.01)", way, 100 * room, wraps[w], mus[m]);
            for (i = 0; i < halvings; i++) {
                const double middle = 0.5 * (low + high);
                if (capstan_way(wraps[w], mus[m], middle) > 0.01) high = middle;
                else low = middle;
            }
            printf("  %8.4f %5.2f %15.4f %10.4f %12.4f  %+.2e of +-%.2e\n", wraps[w], mus[m], low,
                   high, ref, 0.5 * (low + high) / ref - 1, 0.5 * (high - low) / ref);
            CHECK(fabs(0.5 * (low + high) / ref - 1) < 0.03);
        }
    /* 35 a step where edges along the cylinder are contacts: they touch now here, now there */
    printf("  %.1f iterations a step\n", (double)capstan_newton / capstan_steps);
    CHECK(capstan_newton < 8 * capstan_steps);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(threshold);
    return TEST_END();
}
