/* test_contact.c - contact in the step: small scenes, momentum, and no cost when not asked for.
 *   cc -std=c99 -O2 -ffp-contract=off -I. test_contact.c -lm
 * tier: default
 * Thousands of states: stability/contact_scenes.c. SHOW_STEPS=1 prints every step. */
#define CLOTHSIM_IMPLEMENTATION
#include "../clothsim_collide.h"

#include "test.h"
#include "shapes.h"
#include "exact.h"
#include "stage.h"
#include "stage_scenes.h"

static void drape(void) {
    scene_drape(16, 60, 1.0 / 60, CLOTH_INTEGRATOR_EULER, "drape, Euler");
}
static void drape_bdf2(void) {
    scene_drape(16, 60, 1.0 / 60, CLOTH_INTEGRATOR_BDF2, "drape, BDF2");
}
static void drape_leapfrog(void) {
    scene_drape(12, 120, 1.0 / 240, CLOTH_INTEGRATOR_LEAPFROG, "drape, leapfrog");
}
static void fold(void) { scene_fold(14, 90, 1.0 / 120); }
static void crumple(void) { scene_crumple(14, 60, 1.0 / 120); }
static void stack(void) { scene_stack(8, 50, 1.0 / 60); }
static void ring(void) { scene_ring(8, 120, 1.0 / 120); }
static void twist(void) { scene_twist(16, 1, 60, 1.0 / 120); }
static void spin(void) { scene_spin(14, 60, 1.0 / 60); }
static void ball(void) { scene_ball(12, 20); }

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
