/* readme.h - what a program has by the time it comes to a block of README: the quick start's sim,
 * contact and ball. checks.sh quickstart compiles and runs the blocks behind it. */
#include "clothsim_collide.h"
#include <stdio.h>

typedef struct readme {
    cloth_mesh    *sheet;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *contact;
    cloth_obstacle id;
} readme;

#define README_NAMES(r)                                                                          \
    static float   positions[3 * 1024], normals[3 * 1024];                                       \
    const double   wind[3] = {1, 0, 0};                                                          \
    cloth_sim     *sim = (r)->sim;                                                               \
    cloth_collide *contact = (r)->contact;                                                       \
    cloth_obstacle id = (r)->id;                                                                 \
    cloth_status   status = CLOTH_OK;                                                            \
    (void)positions, (void)normals, (void)wind, (void)sim, (void)contact, (void)id;

static int readme_start(readme *r) {
    static const double center[3] = {0.5, -0.4, 0.5};
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_status        status;
    memset(r, 0, sizeof *r);
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 16, 16, 1.0, 1.0, &r->sheet);
    if (status) return status;
    cloth_desc_set_mesh(&desc, r->sheet);
    desc.hooks.log.fn = cloth_log_stderr;
    desc.contact = CLOTH_CONTACT_SELF;
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = 0.3;
    status = cloth_model_create(&desc, &r->model);
    if (!status) status = cloth_sim_create(r->model, &r->sim);
    if (!status) status = cloth_collide_create(r->sim, NULL, &r->contact);
    if (!status) status = cloth_collide_add(r->contact, &ball, &r->id);
    return status;
}

static void readme_end(readme *r) {
    cloth_collide_destroy(r->contact), cloth_sim_destroy(r->sim);
    cloth_model_destroy(r->model), cloth_mesh_destroy(NULL, r->sheet);
}
