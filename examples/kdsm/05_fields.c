/* kdsm/05_fields.c - space that follows a body, and what three methods say of a shirt in it.
 *
 * Notice: left, the shirt as simulated, and the tetrahedra of a cut through the space, skinned with
 * the body. Then the same shirt taken back to rest, u + d, by method 1, method 2 and the hybrid,
 * coloured by |d|. Where an arm lies on the trunk method 1 throws vertices about.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/05_fields.c -lm
 *   page:     out/05_fields.html
 *   expected: three fields, 13 frames, hybrid nearer than method 1: yes
 */
#define KDSM_IMPLEMENTATION
#include "garment.h"
#include "view.h"
#define STEPS 48            /* of 1/60 s                                               */
#define EVERY 4
#define APART 1.1           /* m, from picture to picture                              */
#define CUT   0.005         /* m, half of what is shown of the space                   */

typedef struct scene {
    figure      f;
    garment     g;
    kdsm_space *space;
    kdsm_pose  *pose;
    kdsm_cloth *cloth;
    double     *d, *x, *size, T[12 * SHAPES_BONES], mean[3];
    int        *cut, ncut, mesh[6];
} scene;

/* The faces of the tetrahedra whose middle at rest is in the cut. */
static int cut_through(scene *s) {
    static const int face[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    int              t, k;
    s->cut = (int *)malloc(12 * (size_t)s->space->nt * sizeof(int));
    if (!s->cut) return 0;
    for (t = 0; t < s->space->nt; t++) {
        const int *v = s->space->tet + 4 * t;
        double     z = 0;
        for (k = 0; k < 4; k++) z += 0.25 * s->space->v[3 * v[k] + 2];
        for (k = 0; k < 12 && fabs(z) < CUT; k++) s->cut[3 * s->ncut + k] = v[face[k / 3][k % 3]];
        s->ncut += fabs(z) < CUT ? 4 : 0;
    }
    return 1;
}

static void put(scene *s, view *v, int mesh, int n, const double *x, double shift,
                const double *size) {
    int i;
    for (i = 0; i < 3 * n; i++) s->x[i] = x[i] + (i % 3 == 0 ? shift : 0);
    view_put(v, mesh, s->x, size, NULL);
}

static const char *frame(scene *s, view *v, double t) {
    int m, i;
    if (kdsm_pose_set(s->pose, s->T)) return "the space cannot be posed";
    view_time(v, t);
    put(s, v, s->mesh[0], s->f.nv, s->g.body, 0, NULL);
    memset(s->size, 0, (size_t)s->g.nv * sizeof(double));
    put(s, v, s->mesh[1], s->g.nv, garment_x(&s->g), 0, s->size);
    put(s, v, s->mesh[2], s->space->nv, s->pose->x, -APART, NULL);
    for (m = 0; m < 3; m++) {
        kdsm_options         o = kdsm_options_default();
        kdsm_displace_report r;
        o.method = (kdsm_method)(m + 1);
        if (kdsm_displace(s->cloth, s->pose, garment_x(&s->g), &o, s->d, NULL, &r))
            return "no displacement";
        s->mean[m] += r.d_mean;
        for (i = 0; i < s->g.nv; i++)
            s->size[i] = 100 * sqrt(kdsmi_dot(s->d + 3 * i, s->d + 3 * i));
        for (i = 0; i < 3 * s->g.nv; i++) s->d[i] += s->cloth->u[i];
        put(s, v, s->mesh[3 + m], s->g.nv, s->d, APART * (m + 1), s->size);
    }
    return NULL;
}

static const char *open_scene(scene *s, view *v) {
    static const char *name[3] = {"method 1", "2", "hybrid"};
    kdsm_desc          desc = kdsm_desc_default();
    const char        *error = figure_make(0.03, &s->f);
    size_t             n;
    int                m;
    if (!error) error = garment_make(&s->f, 0.05, &s->g);
    if (error) return error;
    figure_walk(&s->f, 0, s->T);
    figure_body(&s->f, &desc);
    desc.hooks.log.fn = cloth_log_stderr, desc.thickness = 0.1;
    if (kdsm_create(&desc, &s->space) || kdsm_pose_create(s->space, &s->pose)) return "no space";
    error = garment_wear(&s->g, s->T);
    if (error) return error;
    if (kdsm_cloth_create(s->space, s->g.nv, s->g.x0, s->g.nf, s->g.faces, &s->cloth))
        return "the garment cannot be embedded";
    n = (size_t)(s->space->nv + s->f.nv + s->g.nv);
    s->d = (double *)malloc(3 * n * sizeof(double));
    s->x = (double *)malloc(3 * n * sizeof(double));
    s->size = (double *)malloc(n * sizeof(double));
    if (!s->d || !s->x || !s->size || !cut_through(s)) return "out of memory";
    s->mesh[0] = view_mesh(v, "body", VIEW_OBSTACLE, s->f.nv, s->f.nf, s->f.faces);
    s->mesh[1] = view_mesh(v, "shirt", VIEW_CLOTH, s->g.nv, s->g.nf, s->g.faces);
    s->mesh[2] = view_mesh(v, "space", VIEW_OBSTACLE, s->space->nv, s->ncut, s->cut);
    for (m = 0; m < 3; m++)
        s->mesh[3 + m] = view_mesh(v, name[m], VIEW_CLOTH, s->g.nv, s->g.nf, s->g.faces);
    view_scalar(v, 0, "|d|", "cm", VIEW_VERTEX, 0, 8, 16);
    view_camera(v, 0, 5);
    return NULL;
}

int main(void) {
    static scene s;
    view        *v = view_open("A shirt at rest, three ways",
                               "The space round a body, cut; a shirt, simulated; at rest by three "
                               "methods, in the colours of |d|.");
    double       from[3 * SHAPES_BONES], to[3 * SHAPES_BONES];
    const char  *error = open_scene(&s, v), *wrong;
    int          i, frames = 0;
    memset(from, 0, sizeof from);
    figure_angles(&s.f, 0, 1.6, to);
    for (i = 0; i <= STEPS && !error; i++) {
        const double t = (double)i / STEPS;
        figure_between(&s.f, from, to, t * t * (3 - 2 * t), s.T);
        if (i > 0) error = garment_step(&s.g, s.T, 0.1);
        if (!error && i % EVERY == 0) error = frame(&s, v, i * GARMENT_H), frames++;
    }
    wrong = view_close(v, "out/05_fields.html");
    if (!error) error = wrong;
    if (error) fprintf(stderr, "%s\n", error);
    else
        printf("mean |d| of methods 1, 2, hybrid: %.2f, %.2f, %.2f cm\n"
               "three fields, %d frames, hybrid nearer than method 1: %s\n",
               100 * s.mean[0] / frames, 100 * s.mean[1] / frames, 100 * s.mean[2] / frames, frames,
               s.mean[2] < s.mean[0] ? "yes" : "no");
    kdsm_cloth_destroy(s.cloth), kdsm_pose_destroy(s.pose), kdsm_destroy(s.space);
    garment_free(&s.g), figure_free(&s.f);
    free(s.d), free(s.x), free(s.size), free(s.cut);
    return error != NULL;
}
