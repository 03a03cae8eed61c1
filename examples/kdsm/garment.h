/* garment.h - a garment that hangs on a figure and goes where its joints go, simulated by the kit.
 * SPDX-License-Identifier: MIT
 *
 *     garment     g;
 *     const char *error = garment_make(&f, 0.03, &g);                 the shirt of ../shapes.h
 *              or garment_load(&f, "shirt.obj", &g);
 *     error = garment_wear(&g, T);                                    a new sim, at rest under T
 *     error = garment_step(&g, T, 0.1);                               1/60 s to the joints T
 *     error = garment_bring(&g, from, to, 60, T);                     from angles to angles
 *     garment_x(&g), garment_inside(&g)                               where it is
 *     garment_free(&g);
 *
 * Errors are NULL or a sentence. A step that fails leaves the cloth behind: the next tries again.
 */
#ifndef KDSM_EXAMPLE_GARMENT_H
#define KDSM_EXAMPLE_GARMENT_H

#include "figure.h"
#include "clothsim_collide.h"

#define GARMENT_H (1.0 / 60)        /* s, of a step                                     */

typedef struct garment {
    const figure  *f;
    shapes_shirt   shirt;           /* by formula, or                                   */
    cloth_mesh    *mesh;            /* from a file                                      */
    int            nv, nf;
    const int     *faces;
    const double  *x0;              /* as it was made, round the body at rest           */
    const double  *X;               /* flat, or NULL                                    */
    cloth_integrator integrator;    /* of the model                                     */
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *contact;
    cloth_obstacle id;
    double        *body;            /* [f->nv x 3]                                      */
    int            steps, failed;   /* since it was put on                              */
} garment;

static inline void garment_take_off(garment *g) {
    cloth_collide_destroy(g->contact);
    cloth_sim_destroy(g->sim);
    g->contact = NULL, g->sim = NULL;
}

static inline void garment_free(garment *g) {
    garment_take_off(g);
    cloth_model_destroy(g->model);
    cloth_mesh_destroy(NULL, g->mesh);
    shapes_shirt_free(&g->shirt);
    free(g->body);
    memset(g, 0, sizeof *g);
}

static inline const char *garment_model(garment *g, cloth_integrator integrator) {
    cloth_desc desc = cloth_desc_default();
    desc.nv = g->nv, desc.nf = g->nf, desc.faces = g->faces, desc.x_rest = g->x0;
    if (g->X) desc.X = g->X, desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    desc.material = cloth_material_fabric(CLOTH_FABRIC_COTTON_KNIT);
    desc.contact = CLOTH_CONTACT_SELF, desc.integrator = g->integrator = integrator;
    return cloth_model_create(&desc, &g->model) ? "the garment cannot be simulated" : NULL;
}

static inline const char *garment_on(const figure *f, garment *g) {
    g->f = f;
    g->body = (double *)malloc(3 * (size_t)f->nv * sizeof *g->body);
    return g->body ? garment_model(g, CLOTH_INTEGRATOR_EULER) : "out of memory";
}

/* The same by another integrator, not worn. */
static inline const char *garment_again(garment *g, cloth_integrator integrator) {
    garment_take_off(g);
    cloth_model_destroy(g->model);
    g->model = NULL;
    return garment_model(g, integrator);
}

static inline const char *garment_make(const figure *f, double edge, garment *g) {
    const char *error;
    memset(g, 0, sizeof *g);
    error = shapes_shirt_make(edge, &g->shirt);
    if (error) return error;
    g->nv = g->shirt.nv, g->nf = g->shirt.nf, g->faces = g->shirt.faces, g->x0 = g->shirt.x;
    g->X = g->shirt.X;
    return garment_on(f, g);
}

static inline const char *garment_load(const figure *f, const char *path, garment *g) {
    memset(g, 0, sizeof *g);
    if (cloth_obj_load(NULL, path, NULL, &g->mesh)) return "the garment's OBJ cannot be read";
    g->nv = g->mesh->nv, g->nf = g->mesh->nf, g->faces = g->mesh->faces, g->x0 = g->mesh->x;
    return garment_on(f, g);
}

/* A new sim: what it does depends on nothing before. T: the figure's joints at the start; the
 * cloth at x [nv x 3], where it may cross the body and itself. */
static inline const char *garment_wear_at(garment *g, const double *T, const double *x) {
    cloth_collide_desc  c = cloth_collide_desc_default();
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    garment_take_off(g);
    c.initial = CLOTH_INITIAL_EXEMPT;
    if (cloth_sim_create(g->model, &g->sim)) return "no sim";
    memcpy(cloth_sim_state(g->sim)->x, x, 3 * (size_t)g->nv * sizeof *x);
    cloth_sim_state_changed(g->sim);
    if (cloth_collide_create(g->sim, &c, &g->contact)) return "no contact";
    figure_skin(g->f, T, g->body);
    o.kind = CLOTH_OBSTACLE_MESH, o.nv = g->f->nv, o.nf = g->f->nf;
    o.faces = g->f->faces, o.x = g->body;
    o.self_penetrating = g->integrator != CLOTH_INTEGRATOR_LEAPFROG;     /* has no pinches */
    g->steps = g->failed = 0;
    return cloth_collide_add(g->contact, &o, &g->id) ? "the body cannot be an obstacle" : NULL;
}

static inline const char *garment_wear(garment *g, const double *T) {
    return garment_wear_at(g, T, g->x0);
}

/* One step of h s to the joints T; `calm` in [0, 1]: part of the velocity taken away after. */
static inline const char *garment_step_by(garment *g, const double *T, double h, double calm) {
    cloth_state *s = cloth_sim_state(g->sim);
    cloth_report r;
    int          i;
    figure_skin(g->f, T, g->body);
    if (cloth_collide_move(g->contact, g->id, g->body)) return "the body cannot move";
    g->steps++;
    if (cloth_collide_step(g->contact, h, 3, &r)) {
        g->failed++;
        return r.outcome == CLOTH_STEP_NONE ? "the step was refused" : NULL;
    }
    for (i = 0; calm > 0 && i < 3 * g->nv; i++) s->v[i] *= 1 - calm;
    if (calm > 0) cloth_sim_state_changed(g->sim);
    return NULL;
}

static inline const char *garment_step(garment *g, const double *T, double calm) {
    return garment_step_by(g, T, GARMENT_H, calm);
}

/* The joints from the angles `from` to `to` in half of `steps`, then still; T [njoints x 12]: where
 * they end. Friction lets cloth rest in many places: frames of a walk settled so are off a smooth
 * motion by 1.5 mm. Twice the steps, two thirds of them on the way and a fifth of the speed taken,
 * make it 1.3 mm, and what is learned from such poses is no nearer: 1.46 for 1.42 mm. */
static inline const char *garment_bring(garment *g, const double *from, const double *to, int steps,
                                        double *T) {
    const char *error = NULL;
    int         i;
    for (i = 1; i <= steps && !error; i++) {
        const double t = fmin(1, 2.0 * i / steps);
        figure_between(g->f, from, to, t * t * (3 - 2 * t), T);
        error = garment_step(g, T, 0.1);
    }
    return error;
}

static inline const double *garment_x(const garment *g) { return cloth_sim_state(g->sim)->x; }

/* How many vertices of the cloth are more than 3 mm inside of the body as it is now, -1: unknown.
 * By a distance grid, whose sign is that of the winding number; its cells are a millimetre off
 * where a body is as thin as an arm. */
static inline int garment_inside(const garment *g) {
    cloth_grid_desc d = cloth_grid_desc_default();
    cloth_grid     *grid = NULL;
    int             i, inside = 0;
    d.nv = g->f->nv, d.x = g->body, d.nf = g->f->nf, d.faces = g->f->faces;
    d.cell = 0.02, d.band = 0.04;
    if (cloth_grid_create(&d, &grid)) return -1;
    for (i = 0; i < g->nv; i++) {
        double phi = 0;
        if (cloth_grid_sample(grid, garment_x(g) + 3 * (size_t)i, &phi, NULL)) inside = -1;
        inside += phi < -3e-3;
    }
    cloth_grid_destroy(grid);
    return inside;
}

#endif
