/* kdsm/00_space.c - the space round a body, cut open: what a pose does to it.
 *
 * Notice: kdsm_create() meshes the air round the body, kdsm_pose_set() skins it with the body. At
 * rest a point is in one tetrahedron; where an arm comes down on the trunk, so does the air of
 * both: kdsm_locate() then has several candidates, and some tetrahedra turn inside out.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/00_space.c -lm
 *   page:     out/00_space.html
 *   expected: at rest one candidate in the middle of every tetrahedron: yes
 *
 * The page shows a slice, about a tetrahedron thick, each drawn a little smaller than it is.
 * Colours: candidates for its middle; or its volume over that at rest, below 0 where it is turned.
 *
 * Exercises: (1) desc.thickness = 0.04: how far does air reach now, and which cloth would leave it?
 * (2) desc.levels = 0: fewer tetrahedra; are there more candidates? (3) desc.smooth = 0: what do
 * weights that jump do to the space at the armpit?
 */
#define KDSM_IMPLEMENTATION
#include "figure.h"
#include "view.h"
#define FRAMES 25
#define SLICE  0.012        /* m, half of its thickness                                  */

typedef struct slice {
    const kdsm_space *space;
    int              *tet, n;           /* those that are shown                          */
    int              *faces;            /* [4n x 3]                                      */
    double           *x;                /* [4n x 3]                                      */
    double           *count, *ratio;    /* [4n] the same at the four faces of one        */
} slice;

static void slice_free(slice *s) {
    free(s->tet), free(s->faces), free(s->x), free(s->count);
}

/* The tetrahedra whose middle at rest is near the plane z = 0. */
static const char *slice_make(const kdsm_space *space, slice *s) {
    static const int out[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    int              t, k;
    s->space = space;
    s->tet = (int *)malloc((size_t)space->nt * sizeof(int));
    for (t = 0; s->tet && t < space->nt; t++) {
        double z = 0;
        for (k = 0; k < 4; k++) z += space->v[3 * space->tet[4 * t + k] + 2] / 4;
        if (fabs(z) < SLICE) s->tet[s->n++] = t;
    }
    s->faces = (int *)malloc(12 * (size_t)s->n * sizeof(int));
    s->x = (double *)malloc(12 * (size_t)s->n * sizeof(double));
    s->count = (double *)malloc(8 * (size_t)s->n * sizeof(double));
    if (!s->tet || !s->faces || !s->x || !s->count) return "out of memory";
    s->ratio = s->count + 4 * s->n;
    for (t = 0; t < 12 * s->n; t++) s->faces[t] = 4 * (t / 12) + out[t / 3 % 4][t % 3];
    return NULL;
}

/* Places and colours in a pose; the tetrahedra that turned, and the most candidates. */
static const char *slice_pose(slice *s, kdsm_pose *pose, int *turned, int *most) {
    int i, k, a;
    for (*turned = *most = i = 0; i < s->n; i++) {
        double corner[12], rest[12], n[3][3], middle[3] = {0, 0, 0}, ratio;
        int    count;
        kdsmi_corners(pose->x, s->space->tet + 4 * s->tet[i], corner);
        kdsmi_corners(s->space->v, s->space->tet + 4 * s->tet[i], rest);
        for (k = 0; k < 12; k++) middle[k % 3] += corner[k] / 4;
        if (kdsm_locate(pose, middle, 0, NULL, &count, NULL)) return "a point is not located";
        ratio = kdsmi_det(corner, n);
        ratio /= kdsmi_det(rest, n);
        for (k = 0; k < 4; k++) {
            for (a = 0; a < 3; a++)
                s->x[12 * i + 3 * k + a] = middle[a] + 0.8 * (corner[3 * k + a] - middle[a]);
            s->count[4 * i + k] = count, s->ratio[4 * i + k] = ratio;
        }
        *turned += ratio < 0, *most = count > *most ? count : *most;
    }
    return NULL;
}

/* Both arms from where they are at rest onto the trunk, elbows bent. */
static void arms_in(double part, double *T) {
    const double shift[3] = {0, 0, 0};
    double       turn[SHAPES_BONES][3];
    memset(turn, 0, sizeof turn);
    turn[3][2] = -0.7 * part, turn[4][2] = 0.7 * part;
    turn[5][0] = turn[6][0] = -1.2 * part;
    shapes_bones((const double (*)[3])turn, shift, T);
}

static const char *show(kdsm_pose *pose, slice *s) {
    view       *v = view_open("The space round a body",
                               "A slice; both arms come down on the trunk");
    const char *error = NULL, *failed;
    double      T[12 * SHAPES_BONES];
    int         air = view_mesh(v, "space", VIEW_CLOTH, 4 * s->n, 4 * s->n, s->faces), k, once = 0;
    view_scalar(v, 0, "candidates", "", VIEW_VERTEX, 1, HUGE_VAL, 4);
    view_scalar(v, 1, "volume", "of that at rest", VIEW_VERTEX, -1, 1, 3);
    view_camera(v, 0, 4);
    for (k = 0; k < FRAMES && !error; k++) {
        const double t = (double)k / (FRAMES - 1);
        int          turned, most;
        arms_in(t * t * (3 - 2 * t), T);
        if (kdsm_pose_set(pose, T)) error = "the space cannot be posed";
        if (!error) error = slice_pose(s, pose, &turned, &most);
        if (error) break;
        view_time(v, 2 * t);
        view_put(v, air, s->x, s->count, s->ratio);
        if (k == 0) once = most == 1 && turned == 0;
        if (k % 6 == 0) printf("%.2f of the way: %d of %d turned inside out, up to %d candidates\n",
                               t, turned, s->n, most);
    }
    failed = view_close(v, "out/00_space.html");
    if (error || failed) return error ? error : failed;
    printf("at rest one candidate in the middle of every tetrahedron: %s\n", once ? "yes" : "no");
    return NULL;
}

int main(void) {
    figure      f;
    slice       s = {NULL, NULL, 0, NULL, NULL, NULL, NULL};
    kdsm_desc   desc = kdsm_desc_default();
    kdsm_space *space = NULL;
    kdsm_pose  *pose = NULL;
    const char *error = figure_make(0.03, &f);
    if (!error) {
        figure_body(&f, &desc);
        desc.hooks.log.fn = cloth_log_stderr, desc.coarse = 0.09;
        if (kdsm_create(&desc, &space) || kdsm_pose_create(space, &pose)) error = "no space";
    }
    if (!error) error = slice_make(space, &s);
    if (!error) error = show(pose, &s);
    if (error) fprintf(stderr, "%s\n", error);
    slice_free(&s), kdsm_pose_destroy(pose), kdsm_destroy(space), figure_free(&f);
    return error != NULL;
}
