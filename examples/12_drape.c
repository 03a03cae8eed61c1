/* 12_drape.c - the quick start of contact: a sheet falls on a sphere and comes to rest.
 *
 * Notice: desc.contact asks for contact, cloth_collide_create() gives it to the sim, and from then
 * on every cloth_step() keeps the promise: no pair intersects that did not before.
 * Without its lines that say view this is word for word section [1.1] of clothsim_collide.h and
 * the README's first program.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. 12_drape.c -lm
 *   page:     out/12_drape.html
 *   expected: after 1.500 s a smallest gap over 0.5 mm: yes; pairs that intersect: 0
 *
 * Exercises: (1) ball.friction = 0, and 180 frames: the sheet slides off; (2)
 * CLOTH_CONTACT_OBSTACLES: folds that pass through each other: look, for the line counts none:
 * cloth with cloth is not asked, and a sphere has no faces: the gap tells of it; (3) leave out
 * cloth_collide_add(): nothing holds it; (4) center[1] = -0.25, a ball that stands through the
 * sheet: refused. What then leads it out: COURSE.md, lesson 14.
 */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "view.h"
#include <stdio.h>

int main(void) {
    double              center[3] = {0.5, -0.4, 0.5}, gap = 0;          // metres
    int                 frame, pairs = 0;
    cloth_mesh         *sheet = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *contact = NULL;
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    view               *page = view_open("A sheet on a sphere", "");

    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 32, 32, 1.0, 1.0, &sheet)) return 1;
    cloth_desc_set_mesh(&desc, sheet);
    desc.hooks.log.fn = cloth_log_stderr;                               // says what is wrong
    desc.contact = CLOTH_CONTACT_SELF;                                  // and obstacles
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
    if (cloth_collide_create(sim, NULL, &contact)) return 1;
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = 0.3;
    if (cloth_collide_add(contact, &ball, &id)) return 1;
    view_mesh(page, "sheet", VIEW_CLOTH, sheet->nv, sheet->nf, sheet->faces);
    view_pattern(page, 0, sheet->X), view_ball(page, "sphere"), view_camera(page, 28, 14);
    view_caption(page, "1 m x 1 m, 32 x 32 vertices, friction 0.3; steps of 1/60 s.");
    for (frame = 0; frame < 90; frame++) {
        if (cloth_step(sim, 1.0 / 60, NULL)) return 1;                  // seconds
        view_frame(page, cloth_sim_state(sim)->t, cloth_sim_state(sim)->x, NULL);
        view_put_ball(page, 1, center, 0.3 - 0.001);
    }
    if (view_close(page, "out/12_drape.html")) return 1;
    if (cloth_collide_gap(contact, 0.01, &gap)) return 1;
    if (cloth_collide_intersections(contact, 0, NULL, &pairs)) return 1;
    printf("after %.3f s a smallest gap over 0.5 mm: %s; pairs that intersect: %d\n",
           cloth_sim_state(sim)->t, gap > 0.5e-3 ? "yes" : "no", pairs);
    cloth_collide_destroy(contact), cloth_sim_destroy(sim);
    cloth_model_destroy(model), cloth_mesh_destroy(NULL, sheet);
    return 0;
}
