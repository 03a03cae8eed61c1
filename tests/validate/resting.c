/* resting.c - a sheet laid on a sphere stays where it is.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/resting.c -lm
 *
 * Draped for 3 s, then watched for 10 s; the drift is the largest way of a vertex. Friction as a
 * function of speed, however steep, would creep all the time. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

static void drift(void) {
    const double        h = 1.0 / 60, settle = 3, watch = 10;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double              centre[3] = {0.15, -0.2 - FRIC_T, 0.15}, *x0 = NULL, speed = 0;
    fric                s;
    int                 i;
    fric_sheet(&s, 13, 13, 0.3, 0.3);
    s.desc.material.damping = 0.01;
    s.desc.tolerance = 1e-6;
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = centre, o.radius = 0.2, o.friction = 0.5;
    if (!fric_start(&s) || !CHECK(cloth_collide_add(s.contact, &o, NULL) == CLOTH_OK)) goto done;
    for (i = 0; i < settle / h; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
    x0 = (double *)malloc(3 * (size_t)s.nv * sizeof(double));
    if (!x0) goto done;
    memcpy(x0, cloth_sim_state(s.sim)->x, 3 * (size_t)s.nv * sizeof(double));
    printf("  after s   drift m   reference   bound   fastest vertex m/s\n");
    for (i = 1; i <= watch / h; i++) {
        CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
        if (i % 120 && i != watch / h) continue;
        speed = fric_moved(&s, cloth_sim_state(s.sim)->v, s.v);
        printf("  %7.1f  %.2e          0   1e-04   %.2e\n", i * h,
               fric_moved(&s, cloth_sim_state(s.sim)->x, x0), speed);
    }
    CHECK(fric_moved(&s, cloth_sim_state(s.sim)->x, x0) < 1e-4);
done:
    free(x0);
    fric_end(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(drift);
    return TEST_END();
}
