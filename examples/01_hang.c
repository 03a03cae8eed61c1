/* 01_hang.c - the quick start: a pinned sheet falls and swings for a second.
 *
 * Notice: every desc starts from cloth_desc_default(); arrays are copied; every status is checked.
 * Word for word the program of section [1.1] in clothsim.h.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -I.. 01_hang.c -lm
 *   expected: after 1.000 s the far corner is at y = -0.31 m
 *
 * Exercises: (1) pin one corner only; (2) take CLOTH_INTEGRATOR_BDF2: the corner swings higher;
 * (3) material.damping = 0.1: which part of the motion dies, which does not?
 */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include <stdio.h>

int main(void) {
    cloth_mesh  *sheet = NULL;
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_pin    pins[2] = {{0, CLOTH_AXIS_ALL}, {19, CLOTH_AXIS_ALL}};  // two corners
    cloth_desc   desc = cloth_desc_default();                           // always start here
    int          frame;

    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 20, 20, 1.0, 1.0, &sheet)) return 1;
    cloth_desc_set_mesh(&desc, sheet);
    desc.hooks.log.fn = cloth_log_stderr;                               // says what is wrong
    desc.npins = 2, desc.pins = pins;
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
    for (frame = 0; frame < 60; frame++)
        if (cloth_step(sim, 1.0 / 60, NULL)) return 1;                  // seconds
    printf("after %.3f s the far corner is at y = %.2f m\n", cloth_sim_state(sim)->t,
           cloth_sim_state(sim)->x[3 * 399 + 1]);
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, sheet);
    return 0;
}
