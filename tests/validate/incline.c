/* incline.c - a sheet on an inclined plane or mesh sticks and slips on either side of mu = tan a.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/incline.c -lm
 *
 *   sticks   tan a < mu: what moves is the give of the anchors, desc.slip
 *   slips    acceleration g (sin a - mu cos a): implicit Euler goes acc h^2 n (n+1)/2 in n steps
 *
 * Gravity comes down on the plane first, for 0.5 s, then turns: the normal force is there. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

/* Way down the slope in m after n steps of h, with mu = tan a times `part`. */
static double slide(double angle, double part, int mesh, double h, int n) {
    const double mu = part * tan(angle), c = cos(angle), z = sin(angle);
    double       down[3] = {0, -FRIC_G, 0}, press[3] = {0, 0, 0}, way = NAN;
    double      *x0 = NULL;
    fric         s;
    int          i;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    fric_place(&s, angle, (1 - 0.4) * c - z * FRIC_T / 2, (1 - 0.4) * z + c * FRIC_T / 2, 0.45);
    press[0] = FRIC_G * z, press[1] = -FRIC_G * c;
    if (!fric_start(&s) || !CHECK(fric_ground(&s, angle, mu, mesh, 0.17) == CLOTH_OK)) goto done;
    CHECK(cloth_sim_set_gravity(s.sim, press) == CLOTH_OK);
    for (i = 0; i < 0.5 / h; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
    CHECK(cloth_sim_set_gravity(s.sim, down) == CLOTH_OK);
    x0 = (double *)malloc(3 * (size_t)s.nv * sizeof(double));
    if (!x0) goto done;
    memcpy(x0, cloth_sim_state(s.sim)->x, 3 * (size_t)s.nv * sizeof(double));
    for (i = 0; i < n; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
    {
        const double *x = cloth_sim_state(s.sim)->x;
        way = -c * (fric_mean(&s, x, 0) - fric_mean(&s, x0, 0))
            - z * (fric_mean(&s, x, 1) - fric_mean(&s, x0, 1));
    }
done:
    free(x0);
    fric_end(&s);
    return way;
}

static void threshold(void) {
    static const double degrees[] = {10, 30, 45};
    const double        h = 1.0 / 60;
    const int           n = 60;
    int                 k, mesh, side;
    printf("  ground angle  mu/tan a     way m  reference m  difference / (g t^2/2 sin a)\n");
    for (mesh = 0; mesh <= 6; mesh += 6)
        for (k = 0; k < 3; k++)
            for (side = -1; side <= 1; side += 2) {
                const double a = degrees[k] * 3.14159265358979323846 / 180;
                const double part = 1 + 0.01 * side;
                const double acc = part < 1 ? FRIC_G * sin(a) * (1 - part) : 0;
                const double ref = acc * h * h * 0.5 * n * (n + 1);
                const double way = slide(a, part, mesh, h, n);
                const double off = (way - ref) / (0.5 * FRIC_G * sin(a) * (n * h) * (n * h));
                printf("  %-6s %5.0f %9.3f %9.6f %12.6f  %.2e\n", mesh ? "mesh" : "plane",
                       degrees[k], part, way, ref, off);
                if (side > 0) CHECK(fabs(way) < 1e-4);
                else CHECK(fabs(off) < 1e-3);       /* a tenth of the 1 % in mu */
            }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(threshold);
    return TEST_END();
}
