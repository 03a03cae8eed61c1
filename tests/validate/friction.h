/* friction.h - a sheet, its contact and means over its vertices. Included after clothsim_collide.h
 * and test.h. */
#ifndef CLOTH_FRICTION_H
#define CLOTH_FRICTION_H

#define FRIC_G 9.81
#define FRIC_T 2e-3                         /* contact thickness, m */

typedef struct fric {
    cloth_mesh    *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *contact;
    cloth_desc         desc;
    cloth_collide_desc collide;
    double            *x;                   /* [nv x 3] where it starts */
    double            *v;                   /* [nv x 3] */
    int                nv;
} fric;

static void fric_log(cloth_log_level level, cloth_status status, const char *text, void *user) {
    (void)user;
    printf("  log %d, %s: %s\n", (int)level, cloth_status_text(status), text);
}

/* A sheet of nx x ny vertices, lx x ly m, in the plane y = 0, its first corner at the origin. */
static void fric_sheet(fric *s, int nx, int ny, double lx, double ly) {
    memset(s, 0, sizeof *s);
    s->desc = cloth_desc_default();
    s->collide = cloth_collide_desc_default();
    s->collide.thickness = FRIC_T;
    if (!CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, nx, ny, lx, ly, &s->mesh)
               == CLOTH_OK))
        exit(1);
    s->nv = s->mesh->nv;
    s->x = (double *)calloc(6 * (size_t)s->nv, sizeof(double));
    if (!s->x) exit(1);
    s->v = s->x + 3 * s->nv;
    memcpy(s->x, s->mesh->x, 3 * (size_t)s->nv * sizeof(double));
    s->desc.nv = s->nv;
    s->desc.x_rest = s->mesh->x;
    s->desc.x = s->x;
    s->desc.v = s->v;
    s->desc.nf = s->mesh->nf;
    s->desc.faces = s->mesh->faces;
    s->desc.material.membrane = 1000;
    s->desc.material.bending = 1e-5;
    s->desc.material.density = 0.2;
    s->desc.tolerance = 1e-9;               /* friction is decided by what the default leaves */
    s->desc.contact = CLOTH_CONTACT_OBSTACLES;
    s->desc.hooks.log.fn = fric_log;
}

static int fric_start(fric *s) {
    return CHECK(cloth_model_create(&s->desc, &s->model) == CLOTH_OK) &&
           CHECK(cloth_sim_create(s->model, &s->sim) == CLOTH_OK) &&
           CHECK(cloth_collide_create(s->sim, &s->collide, &s->contact) == CLOTH_OK);
}

static void fric_end(fric *s) {
    cloth_collide_destroy(s->contact);
    cloth_sim_destroy(s->sim);
    cloth_model_destroy(s->model);
    cloth_mesh_destroy(NULL, s->mesh);
    free(s->x);
}

/* x' = turned about z by `angle`, then moved by `to`: x axis towards (cos, sin). */
static inline void fric_place(fric *s, double angle, double tx, double ty, double tz) {
    int i;
    for (i = 0; i < s->nv; i++) {
        const double x = s->x[3 * i], y = s->x[3 * i + 1];
        s->x[3 * i] = cos(angle) * x - sin(angle) * y + tx;
        s->x[3 * i + 1] = sin(angle) * x + cos(angle) * y + ty;
        s->x[3 * i + 2] += tz;
    }
}

/* A solid under the plane through the origin that fric_place(angle) turns the sheet into: a plane,
 * or a mesh of n x n squares of `size` m from (-size, -size) on. */
static inline cloth_status fric_ground(fric *s, double angle, double mu, int n, double size) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_mesh         *m = NULL;
    cloth_status        status;
    double              point[3] = {0, 0, 0};
    int                 i;
    o.friction = mu;
    if (n == 0) {
        o.kind = CLOTH_OBSTACLE_PLANE;
        o.x = point;
        o.normal[0] = -sin(angle), o.normal[1] = cos(angle);
        return cloth_collide_add(s->contact, &o, NULL);
    }
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n + 1, n + 1, n * size, n * size, &m);
    if (status) return status;
    for (i = 0; i < m->nv; i++) {
        const double x = m->x[3 * i] - size;
        m->x[3 * i] = cos(angle) * x, m->x[3 * i + 1] = sin(angle) * x;
        m->x[3 * i + 2] -= size;
    }
    o.nv = m->nv, o.x = m->x, o.nf = m->nf, o.faces = m->faces;
    status = cloth_collide_add(s->contact, &o, NULL);
    cloth_mesh_destroy(NULL, m);
    return status;
}

/* Mean of coordinate k of a [nv x 3] array. */
static inline double fric_mean(const fric *s, const double *a, int k) {
    double sum = 0;
    int    i;
    for (i = 0; i < s->nv; i++) sum += a[3 * i + k];
    return sum / s->nv;
}

/* Largest distance of a vertex from where `x0` [nv x 3] has it. */
static inline double fric_moved(const fric *s, const double *x, const double *x0) {
    double worst = 0;
    int    i;
    for (i = 0; i < s->nv; i++) {
        const double dx = x[3 * i] - x0[3 * i], dy = x[3 * i + 1] - x0[3 * i + 1];
        const double dz = x[3 * i + 2] - x0[3 * i + 2];
        worst = fmax(worst, sqrt(dx * dx + dy * dy + dz * dz));
    }
    return worst;
}

#endif
