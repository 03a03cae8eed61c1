/* scene.h - what the tests of models and sims share: a host that counts, fails and listens, a
 * small sheet in every rung, numbers without rand(). Include behind clothsim.h and test.h. */
#ifndef CLOTH_SCENE_H
#define CLOTH_SCENE_H

#include "host.h"

/* --- numbers in [-1, 1) from a counter --- */

static inline double noise(unsigned i) {
    uint64_t z = (uint64_t)i * 0x9e3779b97f4a7c15u + 0x632be59bd9b4e019u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (double)(z >> 11) / 4503599627370496.0 - 1.0;
}

/* --- a sheet of n x n vertices, 0.1 m between them, with what the mask asks for --- */

enum { WITH_PINS = 1, WITH_DAMPING = 2, WITH_WIND = 4, WITH_ATTACH = 8, WITH_FORCE = 16,
       WITH_NOISE = 32, WITH_ALL = 63 };

typedef struct scene {
    cloth_mesh      *mesh;
    cloth_desc       desc;                  /* desc.pins is NULL again after scene_open()      */
    cloth_model     *model;
    cloth_sim       *sim;
    cloth_attachment attachment;
    double          *start;                 /* [nv x 3] desc.x                                 */
    int              nv;
} scene;

static inline void scene_close(scene *s) {
    cloth_sim_destroy(s->sim);
    cloth_model_destroy(s->model);
    cloth_mesh_destroy(NULL, s->mesh);
    free(s->start);
    memset(s, 0, sizeof *s);
}

/* The mesh and a desc with no model yet: a test may change the desc, then scene_open(). */
static inline void scene_desc(scene *s, int n, const cloth_hooks *hooks, int with) {
    int i;
    memset(s, 0, sizeof *s);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_EQUILATERAL, n, n, 0.1 * (n - 1), 0.1 * (n - 1),
                         &s->mesh)) {
        printf("no mesh\n");
        exit(2);
    }
    s->nv = s->mesh->nv;
    s->desc = cloth_desc_default();
    if (hooks) s->desc.hooks = *hooks;
    s->desc.nv = s->mesh->nv;
    s->desc.x_rest = s->mesh->x;
    s->desc.nf = s->mesh->nf;
    s->desc.faces = s->mesh->faces;
    s->desc.material.membrane = 200.0;
    s->desc.material.bending = 1e-4;
    s->desc.tolerance = 1e-6;
    if (with & WITH_DAMPING) s->desc.material.damping = 2e-3;
    if (with & WITH_WIND) {
        s->desc.wind_on = 1;
        s->desc.wind[0] = 3.0;
        s->desc.wind[1] = 1.0;
        s->desc.wind[2] = -2.0;
    }
    if (with & WITH_NOISE) {
        s->start = (double *)malloc(3 * (size_t)s->nv * sizeof(double));
        for (i = 0; s->start && i < 3 * s->nv; i++)
            s->start[i] = s->mesh->x[i] + 0.01 * noise((unsigned)i);
        s->desc.x = s->start;
    }
}

/* Model and sim; pins two corners, attaches a face, sets forces, as asked. */
static inline cloth_status scene_open(scene *s, int with) {
    static const double third[3] = {0.25, 0.35, 0.4}, up[3] = {0.1, 0.15, 0.1};
    cloth_pin    pin[2];
    cloth_status status;
    double      *f;
    int          i;
    pin[0].vertex = 0;
    pin[0].axes = CLOTH_AXIS_ALL;
    pin[1].vertex = s->nv - 1;
    pin[1].axes = CLOTH_AXIS_X | CLOTH_AXIS_Y;
    if (with & WITH_PINS) {
        s->desc.npins = 2;
        s->desc.pins = pin;
    }
    status = cloth_model_create(&s->desc, &s->model);
    s->desc.pins = NULL;
    if (!status) status = cloth_sim_create(s->model, &s->sim);
    if (!status && (with & WITH_ATTACH))
        status = cloth_sim_attach(s->sim, s->mesh->nf / 2, third, 5.0, up, &s->attachment);
    if (!status && (with & WITH_FORCE)) {
        f = (double *)malloc(3 * (size_t)s->nv * sizeof(double));
        for (i = 0; f && i < 3 * s->nv; i++) f[i] = 1e-3 * noise(7000u + (unsigned)i);
        status = cloth_sim_set_force(s->sim, f);
        free(f);
    }
    return status;
}

/* One sheet in one rung, open. Ends the program when it cannot be made. */
static inline scene scene_make(int n, cloth_membrane membrane, cloth_bend_model bend,
                               cloth_integrator integrator, const cloth_hooks *hooks, int with) {
    scene s;
    scene_desc(&s, n, hooks, with);
    s.desc.membrane = membrane;
    s.desc.bend = bend;
    s.desc.integrator = integrator;
    if (scene_open(&s, with) != CLOTH_OK) {
        printf("the scene could not be made\n");
        exit(2);
    }
    return s;
}

#define FOR_INTEGRATORS(i)                                                                       \
    for (i = (int)CLOTH_INTEGRATOR_LEAPFROG; i <= (int)CLOTH_INTEGRATOR_BDF2; i++)

static inline const char *integrator_name(int i) {
    return i == CLOTH_INTEGRATOR_LEAPFROG ? "leapfrog" : i == CLOTH_INTEGRATOR_EULER ? "euler"
                                                                                     : "bdf2";
}

#endif
