/* collide_world.h - a sheet 8 x 8 that falls on a ball over a plane; the ball moves sideways.
 * Include behind clothsim_collide.h and test.h. */
#ifndef CLOTH_COLLIDE_WORLD_H
#define CLOTH_COLLIDE_WORLD_H

#include "host.h"

typedef struct world {
    cloth_mesh    *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle ball, ground;
} world;

static inline void world_close(world *w) {
    cloth_collide_destroy(w->c);
    cloth_sim_destroy(w->sim);
    cloth_model_destroy(w->model);
    cloth_mesh_destroy(NULL, w->mesh);
    memset(w, 0, sizeof *w);
}

/* Model, sim and contact of d, whose mesh is w's or another. */
static inline cloth_status world_start(world *w, const cloth_desc *d,
                                       const cloth_collide_desc *contact) {
    cloth_status status = cloth_model_create(d, &w->model);
    if (!status) status = cloth_sim_create(w->model, &w->sim);
    return status ? status : cloth_collide_create(w->sim, contact, &w->c);
}

static inline cloth_status world_obstacles(world *w) {
    static const double center[3] = {0.1, -0.08, 0.1}, ground[3] = {0, -0.2, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_status        status;
    o.kind = CLOTH_OBSTACLE_SPHERE;
    o.x = center;
    o.radius = 0.06;
    o.friction = 0.1;
    status = cloth_collide_add(w->c, &o, &w->ball);
    o.kind = CLOTH_OBSTACLE_PLANE;
    o.x = ground;
    return status ? status : cloth_collide_add(w->c, &o, &w->ground);
}

static inline cloth_status world_open(world *w, cloth_integrator integrator,
                                      const cloth_hooks *hooks,
                                      const cloth_collide_desc *contact) {
    cloth_desc   d = cloth_desc_default();
    cloth_status status;
    memset(w, 0, sizeof *w);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 8, 8, 0.2, 0.2, &w->mesh)) exit(2);
    if (hooks) d.hooks = *hooks;
    d.nv = w->mesh->nv, d.x_rest = w->mesh->x, d.nf = w->mesh->nf, d.faces = w->mesh->faces;
    d.material.membrane = 300;
    d.material.bending = 1e-5;
    d.material.density = 0.2;
    d.integrator = integrator;
    d.contact = CLOTH_CONTACT_SELF;
    status = world_start(w, &d, contact);
    return status ? status : world_obstacles(w);
}

/* An upright box; *id may be NULL. */
static inline cloth_status world_box(world *w, const double center[3], const double half[3],
                                     cloth_obstacle *id) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double              x[24];
    o.kind = CLOTH_OBSTACLE_BOX;
    o.x = x;
    cloth_obstacle_box(center, half, NULL, x);
    return cloth_collide_add(w->c, &o, id);
}

static inline double world_h(cloth_integrator integrator) {
    return integrator == CLOTH_INTEGRATOR_LEAPFROG ? 1.0 / 480 : 1.0 / 60;
}

/* n steps; the ball moves sideways. */
static inline int world_run(world *w, int n, double h) {
    int i, ok = 1;
    for (i = 0; i < n; i++) {
        double center[3] = {0.1, -0.08, 0.1};
        center[0] += 0.1 * (cloth_sim_state(w->sim)->t + h);
        ok = cloth_collide_move(w->c, w->ball, center) == CLOTH_OK &&
             cloth_step(w->sim, h, NULL) == CLOTH_OK && ok;
    }
    return ok;
}

#endif
