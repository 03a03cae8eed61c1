/* contact_scenes.c - thousands of states with contact, none with an intersection that is new.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. stability/contact_scenes.c -lm
 * tier: full
 * SHOW_STEPS=1 in the environment prints every step. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "../shapes.h"
#include "../exact.h"
#include "../stage.h"
#include "../stage_scenes.h"

static void drape(void) {
    scene_drape(40, 240, 1.0 / 60, CLOTH_INTEGRATOR_EULER, "drape, Euler");
}
static void drape_bdf2(void) {
    scene_drape(40, 240, 1.0 / 60, CLOTH_INTEGRATOR_BDF2, "drape, BDF2");
}
static void drape_leapfrog(void) {
    scene_drape(24, 1920, 1.0 / 1920, CLOTH_INTEGRATOR_LEAPFROG, "drape, leapfrog");
}
static void fold(void) { scene_fold(32, 300, 1.0 / 120); }
static void crumple(void) { scene_crumple(32, 240, 1.0 / 120); }
static void stack(void) { scene_stack(20, 240, 1.0 / 60); }
static void ring(void) { scene_ring(20, 480, 1.0 / 120); }
static void twist(void) { scene_twist(24, 3, 480, 1.0 / 120); }
static void spin(void) { scene_spin(32, 300, 1.0 / 60); }
static void ball(void) { scene_ball(24, 60); }

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    stage_title();
    RUN(drape);
    RUN(drape_bdf2);
    RUN(drape_leapfrog);
    RUN(fold);
    RUN(crumple);
    RUN(stack);
    RUN(ring);
    RUN(twist);
    RUN(spin);
    RUN(ball);
    return TEST_END();
}
