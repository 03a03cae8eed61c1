/* statics.h - what the static reference problems share: a sheet with pins and ties and its sim, a
 * static solve that says how it went, rows of a reference table, an observed order. */
#ifndef CLOTH_STATICS_H
#define CLOTH_STATICS_H

#include "clothsim.h"
#include "reference.h"
#include "test.h"

typedef struct scene {
    cloth_mesh  *mesh;
    cloth_desc   desc;
    cloth_pin   *pins;                      /* room for nv                                     */
    cloth_tie   *ties;                      /* room for nv                                     */
    cloth_model *model;
    cloth_sim   *sim;
    cloth_report report;                    /* of the last solve                               */
} scene;

static inline void scene_log(cloth_log_level level, cloth_status status, const char *text,
                             void *user) {
    (void)status;
    (void)user;
    if (level == CLOTH_LOG_ERROR) printf("  %s\n", text);
}

/* Takes the mesh; no gravity, no wind, exact statics. */
static inline void scene_begin(scene *s, cloth_mesh *mesh) {
    memset(s, 0, sizeof *s);
    s->mesh = mesh;
    s->desc = cloth_desc_default();
    s->desc.hooks.log.fn = scene_log;
    s->desc.nv = mesh->nv;
    s->desc.nf = mesh->nf;
    s->desc.x_rest = mesh->x;
    s->desc.faces = mesh->faces;
    s->desc.gravity[1] = 0;
    s->desc.tolerance = 1e-11;
    s->pins = (cloth_pin *)calloc((size_t)mesh->nv, sizeof *s->pins);
    s->ties = (cloth_tie *)calloc((size_t)mesh->nv, sizeof *s->ties);
    s->desc.pins = s->pins;
    s->desc.ties = s->ties;
}

/* A sheet of the kit: width along x, height along z. */
static inline void scene_sheet(scene *s, cloth_sheet_pattern pattern, int nx, int ny, double width,
                               double height) {
    cloth_mesh *mesh = NULL;
    CHECK(cloth_mesh_sheet(NULL, pattern, nx, ny, width, height, &mesh) == CLOTH_OK);
    scene_begin(s, mesh);
}

static inline void scene_material(scene *s, double density, double Yh, double nu, double D) {
    s->desc.material.density = density;
    s->desc.material.membrane = Yh;
    s->desc.material.poisson = nu;
    s->desc.material.bending = D;
}

static inline void scene_pin(scene *s, int vertex, unsigned axes) {
    cloth_pin *p = s->pins + s->desc.npins++;
    p->vertex = vertex;
    p->axes = axes;
}

static inline void scene_tie(scene *s, int leader, int follower, unsigned axes) {
    cloth_tie *t = s->ties + s->desc.nties++;
    t->leader = leader;
    t->follower = follower;
    t->axes = axes;
}

static inline int scene_start(scene *s) {
    cloth_status status = cloth_model_create(&s->desc, &s->model);
    if (!status) status = cloth_sim_create(s->model, &s->sim);
    CHECK(status == CLOTH_OK);
    return status == CLOTH_OK;
}

static inline int scene_solve(scene *s) {
    cloth_status status = cloth_solve_static(s->sim, &s->report);
    if (status || s->report.outcome != CLOTH_STEP_CONVERGED)
        printf("  static solve: %s, outcome %d, %d iterations, last update %.3g m\n",
               cloth_status_text(status), (int)s->report.outcome, s->report.newton,
               s->report.residual_m);
    CHECK(status == CLOTH_OK && s->report.outcome == CLOTH_STEP_CONVERGED);
    return status == CLOTH_OK && s->report.outcome == CLOTH_STEP_CONVERGED;
}

static inline double *scene_x(const scene *s) { return cloth_sim_state(s->sim)->x; }

static inline void scene_end(scene *s) {
    cloth_sim_destroy(s->sim);
    cloth_model_destroy(s->model);
    cloth_mesh_destroy(NULL, s->mesh);
    free(s->pins);
    free(s->ties);
    memset(s, 0, sizeof *s);
}

/* --- tables: a file of numbers separated by commas; a field that is text is read as 0 --- */

typedef struct table {
    int     rows, columns;
    double *at;                             /* [rows x columns]                                */
    char  (*line)[512];                     /* the lines, for fields that are text             */
} table;

/* NULL rows when the file is absent. The first line is a heading. */
static inline table table_read(const char *name) {
    table       t;
    const char *path = test_shared(name);
    FILE       *f = *path ? fopen(path, "r") : NULL;
    char        line[512];
    int         room = 2048, k;
    memset(&t, 0, sizeof t);
    if (!f) return t;
    t.line = (char (*)[512])malloc((size_t)room * 512);
    while (fgets(line, sizeof line, f) && t.rows <= room) {
        char *p = line;
        if (t.columns == 0) {
            for (t.columns = 1; *p; p++) t.columns += *p == ',';
            t.at = (double *)calloc((size_t)room * (size_t)t.columns, sizeof *t.at);
            continue;
        }
        strcpy(t.line[t.rows], line);
        for (k = 0; k < t.columns && p; k++) {
            t.at[t.rows * t.columns + k] = strtod(p, NULL);
            p = strchr(p, ',');
            if (p) p++;
        }
        t.rows++;
    }
    fclose(f);
    return t;
}

static inline void table_free(table *t) {
    free(t->at);
    free(t->line);
    memset(t, 0, sizeof *t);
}

/* Order p of e = C h^p from errors at h and h/2. */
static inline double order_of(double coarse, double fine) {
    return log(fabs(coarse) / fabs(fine)) / log(2.0);
}

#endif
