/* 16_walk.c - a T-shirt walks: cloth on a moving body whose arms enter its trunk.
 *
 * Notice: cloth_collide_move() says where the body shall be at the END of the step;
 * self_penetrating: cloth between parts of the body that come nearer than it has room for (armpits)
 * is carried by both until they part: cloth_collide_last().held, cloth_collide_holds();
 * cloth_collide_step() takes h/2, h/4, .. where contact cannot be resolved and says what fraction
 * it reached; what fails leaves the state as before: the next step tries again.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 16_walk.c -lm
 *   run:      16_walk [GARMENT.obj BODY.obj WEIGHTS.txt MOTION.skin]
 *             weights: a line 'vertex bone weight' each, # comments; motion: 8 bytes, then uint32
 *             frames, bones and two more, then frames x bones x 12 floats, rows of [R | t], 120 Hz
 *   page:     out/16_walk.html
 *   expected: new intersections: 0
 *
 * A captured walk puts hands into hips and thighs into each other. Cloth held there may cross
 * itself or the parts that hold it: exempt, listed, and counted as new here until it has parted.
 *
 * Exercises: (1) body.friction = 0: after 1 s the shirt hangs 0.3 mm higher in the mean: its
 * cut holds it; (2) self_penetrating = 0: no step fails, for this body hardly enters itself; try it
 * with a captured one; (3) contact.thickness = 4e-3: more pairs, 5 % more time.
 */
#include "clothsim_collide.h"
#include "shapes.h"
#include "view.h"
#include <time.h>
#define STEPS 60
typedef struct walker {             /* the body: by formula, or from files             */
    shapes_body shape;
    cloth_mesh *mesh;
    uint32_t    head[4];            /* frames, bones, rate, unused                     */
    float      *skin;               /* [frames x bones x 12]                           */
    int         n, *vertex, *bone;  /* of the weights [n]                              */
    double     *weight;
} walker;

static double seconds(void *user) { (void)user; return (double)clock() / CLOCKS_PER_SEC; }

/* The body at time t, x [nv x 3]: files run from frame 0 at 120 Hz, held at their end. */
static void pose(const walker *w, double t, double *x) {
    double at = fmin(120 * t, w->mesh ? (double)w->head[0] - 1 : 0), part;
    size_t frame = (size_t)at, bones = w->head[1];
    if (!w->mesh) {
        shapes_body_walk(&w->shape, t, 0.0, x);
        return;
    }
    if (frame + 1 >= w->head[0]) frame = w->head[0] - 2;
    part = at - (double)frame;
    memset(x, 0, 3 * (size_t)w->mesh->nv * sizeof *x);
    for (int i = 0; i < w->n; i++) {
        const float  *m = w->skin + 12 * (frame * bones + (size_t)w->bone[i]), *n = m + 12 * bones;
        const double *v = w->mesh->x + 3 * w->vertex[i];
        for (int k = 0; k < 3; k++) for (int j = 0; j < 4; j++) {
            double a = (double)m[4 * k + j], b = (double)n[4 * k + j];
            x[3 * w->vertex[i] + k] += w->weight[i] * (a + part * (b - a)) * (j < 3 ? v[j] : 1);
        }
    }
}

/* Reads what the opening comment describes; NULL or what was wrong. */
static const char *load(walker *w, const char *body, const char *weights, const char *motion) {
    static char said[100];
    char        line[256], *moved = NULL;
    size_t      count;
    const char *error = "the motion file does not fit its head";
    FILE       *f = NULL;
    if (cloth_obj_load(NULL, body, NULL, &w->mesh)) return "the body's OBJ cannot be read";
    if ((f = fopen(motion, "rb")) == NULL) return "the motion file cannot be opened";
    if (fread(line, 1, 8, f) != 8 || fread(w->head, 4, 4, f) != 4) goto done;
    if (w->head[0] < 2 || w->head[0] > 100000 || w->head[1] < 1 || w->head[1] > 1000) goto done;
    count = 12 * (size_t)w->head[0] * w->head[1];
    w->skin = (float *)malloc(count * sizeof *w->skin);
    if (w->skin == NULL || fread(w->skin, sizeof *w->skin, count, f) != count) goto done;
    fclose(f);
    error = "the weights do not fit body and motion";
    if ((f = fopen(weights, "r")) == NULL) return "the weights cannot be opened";
    w->vertex = (int *)malloc(16 * (size_t)w->mesh->nv * sizeof *w->vertex);
    w->bone = (int *)malloc(16 * (size_t)w->mesh->nv * sizeof *w->bone);
    w->weight = (double *)malloc(16 * (size_t)w->mesh->nv * sizeof *w->weight);
    moved = (char *)calloc((size_t)w->mesh->nv, 1);
    while (w->vertex && w->bone && w->weight && moved && fgets(line, sizeof line, f)) {
        int i = w->n;
        if (line[0] == '#') continue;
        if (i == 16 * w->mesh->nv) goto done;
        if (sscanf(line, "%d %d %lf", w->vertex + i, w->bone + i, w->weight + i) != 3) goto done;
        if (w->vertex[i] < 0 || w->vertex[i] >= w->mesh->nv) goto done;
        if (w->bone[i] < 0 || w->bone[i] >= (int)w->head[1]) goto done;
        moved[w->vertex[i]] |= w->weight[i] > 0;
        w->n++;
    }
    error = w->n > 0 ? NULL : "no weights";
    for (int i = 0; i < w->mesh->nv && !error; i++)         /* it would lie at the origin */
        if (!moved[i]) sprintf(said, "vertex %d of the body has no weight", i), error = said;
done:
    free(moved);
    if (f) fclose(f);
    return error;
}

int main(int argc, char **argv) {
    cloth_desc          desc = cloth_desc_default();
    cloth_collide_desc  contact = cloth_collide_desc_default();
    cloth_obstacle_desc body = cloth_obstacle_desc_default();
    cloth_mesh         *garment = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *collide = NULL;
    cloth_obstacle      id;
    shapes_shirt        shirt = {0};
    walker              w = {0};
    const char         *error = NULL;
    double             *x = NULL, ms = 0, part = 0;
    int                 solved = 0, whole = 0, before = 0, after = 0;
    cloth_status        status = CLOTH_OK;
    view               *page = NULL;
    char                caption[300];
    desc.hooks.log.fn = cloth_log_stderr, desc.hooks.clock.fn = seconds;
    if (argc > 4) {
        if ((status = cloth_obj_load(&desc.hooks, argv[1], NULL, &garment)) != CLOTH_OK) goto end;
        if ((error = load(&w, argv[2], argv[3], argv[4])) != NULL) goto end;
        desc.nv = garment->nv, desc.nf = garment->nf, desc.faces = garment->faces;
        desc.x_rest = garment->x;
        body.nv = w.mesh->nv, body.nf = w.mesh->nf, body.faces = w.mesh->faces;
    } else {
        if ((error = shapes_body_make(0.029, &w.shape)) != NULL) goto end;
        if ((error = shapes_shirt_make(0.024, &shirt)) != NULL) goto end;
        desc.nv = shirt.nv, desc.nf = shirt.nf, desc.faces = shirt.faces;
        desc.X = shirt.X, desc.x_rest = shirt.x, desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
        body.nv = w.shape.nv, body.nf = w.shape.nf, body.faces = w.shape.faces;
    }
    status = CLOTH_ERR_MEMORY;
    if ((x = (double *)malloc(3 * (size_t)body.nv * sizeof *x)) == NULL) goto end;
    desc.material = cloth_material_fabric(CLOTH_FABRIC_COTTON_KNIT);
    desc.contact = CLOTH_CONTACT_SELF;
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto end;
    if ((status = cloth_sim_create(model, &sim)) != CLOTH_OK) goto end;
    contact.initial = CLOTH_INITIAL_EXEMPT;             /* what crosses at the start may part */
    if ((status = cloth_collide_create(sim, &contact, &collide)) != CLOTH_OK) goto end;
    pose(&w, 0, x);
    body.x = x, body.self_penetrating = 1;
    if ((status = cloth_collide_add(collide, &body, &id)) != CLOTH_OK) goto end;
    if ((status = cloth_collide_intersections(collide, 0, NULL, &before)) != CLOTH_OK) goto end;
    page = view_open(w.mesh ? "A garment on a captured walk" : "A walk in a T-shirt", "");
    view_mesh(page, "cotton knit", VIEW_CLOTH, desc.nv, desc.nf, desc.faces);
    view_pattern(page, 0, desc.X);
    view_mesh(page, "body", VIEW_OBSTACLE, body.nv, body.nf, body.faces);
    view_camera(page, 32, 8);
    for (int step = 1; step <= STEPS; step++) {
        cloth_report r;
        pose(&w, step / 60.0, x);
        if ((status = cloth_collide_move(collide, id, x)) != CLOTH_OK) break;
        status = cloth_collide_step(collide, 1.0 / 60, 3, &r);
        part = cloth_collide_last(collide).fraction;
        solved += status == CLOTH_OK, whole += !status && part > 0.999, ms += r.ms.total;
        if (status && r.outcome == CLOTH_STEP_NONE) break;      /* misuse, not contact */
        status = CLOTH_OK;
        view_frame(page, step / 60.0, cloth_sim_state(sim)->x, NULL);
        view_put(page, 1, x, NULL, NULL);
        if (step % 30 == 0) printf("%.1f s: %d of %d steps whole, %d solved; %.0f ms a step\n",
                                   step / 60.0, whole, step, solved, ms / step);
    }
    if (status) goto end;
    status = cloth_collide_intersections(collide, 0, NULL, &after);
    sprintf(caption, "%d faces on a body of %d that penetrates itself; contact everywhere, "
            "friction 0.3; %d of %d steps of 1/60 s whole, %.0f ms each; pairs of faces that "
            "intersect: %d at the start, %d at the end.", desc.nf, body.nf, whole, STEPS,
            ms / STEPS, before, after);
    view_caption(page, caption);
    error = view_close(page, "out/16_walk.html");
    page = NULL;
    printf("new intersections: %d\n", after > before ? after - before : 0);
end:
    if (status || error) fprintf(stderr, "%s\n", error ? error : cloth_status_text(status));
    view_free(page);
    cloth_collide_destroy(collide), cloth_sim_destroy(sim), cloth_model_destroy(model);
    cloth_mesh_destroy(&desc.hooks, garment), cloth_mesh_destroy(NULL, w.mesh);
    shapes_shirt_free(&shirt), shapes_body_free(&w.shape);
    free(w.skin), free(w.vertex), free(w.bone), free(w.weight), free(x);
    return status != CLOTH_OK || error != NULL;
}
