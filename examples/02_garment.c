/* 02_garment.c - a shirt on a hanger that is carried, turned and stopped.
 *
 * Notice: desc.X holds the flat cut of each panel, though the cloth starts round; cloth_sim_pin()
 * says where a pin shall be at the END of the step; cloth_sim_stretches() colours the page;
 * hooks.log names field and value of each refusal. No contact: front and back may cross.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 02_garment.c -lm
 *   run:      02_garment [FILE.obj [SIZE [PATTERN]]]
 *             SIZE: longest side in m, PATTERN: m per unit of vt when vt is the cut (both: 0)
 *   page:     out/02_garment.html
 *   expected: 240 of 240 steps solved
 *
 * Pins: of the shirt all above 4 cm below its shoulder seams. Of a file: left and right of the
 * middle the vertex with the largest y + |x - middle| / 4 (of two alike the one in front), and all
 * within 6 % of the mesh's diagonal of either: a shirt's shoulders, a skirt's hips.
 *
 * Exercises: (1) material = cloth_material_fabric(CLOTH_FABRIC_DENIM): fewer folds, and the
 * sleeves stand; (2) leave out desc.rest_angle: what was round at the start closes less;
 * (3) desc.integrator = CLOTH_INTEGRATOR_BDF2: it swings on for longer after the stop. */
#include "clothsim.h"
#include "shapes.h"
#include "view.h"
#include <time.h>
#define STEPS 240
static double seconds(void *user) { (void)user; return (double)clock() / CLOCKS_PER_SEC; }

static double smooth(double t, double from, double to) {    /* 0 to 1 with soft ends */
    double s = fmin(fmax((t - from) / (to - from), 0), 1);
    return s * s * s * (10 - 15 * s + 6 * s * s);
}

/* The hanger: 0.45 m to the side, then a full turn about its middle c. */
static void carry(double t, const double c[3], const double p[3], double out[3]) {
    double turn = 6.283185 * smooth(t, 1.3, 3.1), x = p[0] - c[0], z = p[2] - c[2];
    out[0] = c[0] + x * cos(turn) + z * sin(turn) + 0.45 * smooth(t, 0.4, 1.4);
    out[1] = p[1], out[2] = c[2] - x * sin(turn) + z * cos(turn);
}

/* A number from 0, and nothing behind it. */
static int number(const char *text, double *out) {
    char *end;
    *out = strtod(text, &end);
    return end != text && *end == 0 && *out >= 0 && *out < HUGE_VAL;
}

/* The rule of the opening comment. Returns the number of pins [nv]. */
static int find_pins(const cloth_desc *d, const double lo[3], const double hi[3], cloth_pin *pins) {
    double middle = 0.5 * (lo[0] + hi[0]), best[2] = {-HUGE_VAL, -HUGE_VAL}, reach = 0;
    int    top[2] = {0, 0}, n = 0;
    for (int k = 0; k < 3; k++) reach += 0.0036 * (hi[k] - lo[k]) * (hi[k] - lo[k]);
    for (int i = 0; i < d->nv; i++) {
        const double *p = d->x_rest + 3 * i;
        double score = p[1] + fabs(p[0] - middle) / 4 + (p[2] - lo[2]) / 100;
        int    side = p[0] > middle;
        if (score > best[side]) best[side] = score, top[side] = i;
    }
    for (int i = 0; i < d->nv; i++) for (int side = 0; side < 2; side++) {
        const double *p = d->x_rest + 3 * i, *q = d->x_rest + 3 * top[side];
        double        x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
        if (x * x + y * y + z * z <= reach && (n == 0 || pins[n - 1].vertex != i))
            pins[n].vertex = i, pins[n++].axes = CLOTH_AXIS_ALL;
    }
    return n;
}

int main(int argc, char **argv) {
    cloth_desc        desc = cloth_desc_default();
    cloth_obj_options read = cloth_obj_options_default();
    cloth_mesh       *mesh = NULL;
    cloth_model      *model = NULL;
    cloth_sim        *sim = NULL;
    cloth_pin        *pins = NULL;
    cloth_report      r = {0};
    shapes_shirt      shirt = {0};
    view             *page;
    const char       *error = NULL, *name = "a T-shirt", *slash;
    double           *stretch = NULL, lo[3], hi[3], c[3] = {0, 0, 0}, scale, ms = 0;
    double            size = 0, cut = 0;
    int               done = 0, newton = 0;
    cloth_status      status = CLOTH_OK;
    char              caption[300];
    desc.hooks.log.fn = cloth_log_stderr, desc.hooks.clock.fn = seconds;
    if (argc > 1) {
        name = (slash = strrchr(argv[1], '/')) != NULL ? slash + 1 : argv[1];
        if ((argc > 2 && !number(argv[2], &size)) || (argc > 3 && !number(argv[3], &cut))) {
            error = "SIZE and PATTERN are numbers from 0";
            goto end;
        }
        read.pattern_scale = cut;
        if ((status = cloth_obj_load(&desc.hooks, argv[1], &read, &mesh)) != CLOTH_OK) goto end;
        desc.nv = mesh->nv, desc.nf = mesh->nf, desc.faces = mesh->faces;
        desc.X = mesh->X, desc.x_rest = mesh->x;
    } else {
        if ((error = shapes_shirt_make(0.024, &shirt)) != NULL) goto end;
        desc.nv = shirt.nv, desc.nf = shirt.nf, desc.faces = shirt.faces;
        desc.X = shirt.X, desc.x_rest = shirt.x;
    }
    pins = (cloth_pin *)malloc((size_t)desc.nv * sizeof *pins);
    stretch = (double *)malloc((size_t)desc.nf * sizeof *stretch);
    if (!pins || !stretch) { error = "out of memory"; goto end; }
    for (int k = 0; k < 3; k++) {
        lo[k] = HUGE_VAL, hi[k] = -HUGE_VAL;
        for (int i = k; i < 3 * desc.nv; i += 3)
            lo[k] = fmin(lo[k], desc.x_rest[i]), hi[k] = fmax(hi[k], desc.x_rest[i]);
    }
    scale = size / fmax(hi[0] - lo[0], fmax(hi[1] - lo[1], hi[2] - lo[2]));
    for (int i = 0; mesh && scale > 0 && i < 3 * mesh->nv; i++) mesh->x[i] *= scale;
    for (int k = 0; k < 3 && scale > 0; k++) lo[k] *= scale, hi[k] *= scale;
    if (mesh) desc.npins = find_pins(&desc, lo, hi, pins);
    else {
        double low = HUGE_VAL;
        for (int i = 0; i < shirt.npins; i++) low = fmin(low, shirt.x[3 * shirt.pins[i] + 1]);
        for (int i = 0; i < desc.nv; i++) if (shirt.x[3 * i + 1] > low - 0.04)
            pins[desc.npins].vertex = i, pins[desc.npins++].axes = CLOTH_AXIS_ALL;
    }
    desc.pins = pins;
    for (int i = 0; i < desc.npins; i++) for (int k = 0; k < 3; k++)
        c[k] += desc.x_rest[3 * pins[i].vertex + k] / desc.npins;
    desc.material = cloth_material_fabric(CLOTH_FABRIC_COTTON_KNIT);
    desc.rest_angle = CLOTH_REST_ANGLE_FLAT;                /* cut from flat cloth */
    desc.wind_on = 1;                                       /* still air, which drags */
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto end;
    if ((status = cloth_sim_create(model, &sim)) != CLOTH_OK) goto end;
    page = view_open("A garment on a hanger", "");
    view_camera(page, 15, 8), view_floor(page, lo[1] - 0.1);
    view_mesh(page, "cotton knit", VIEW_CLOTH, desc.nv, desc.nf, desc.faces);
    view_pattern(page, 0, desc.X);
    view_scalar(page, 0, "largest stretch", "m/m", VIEW_FACE, 1.0, 1.0, 1.04);
    for (int step = 1; step <= STEPS; step++, done++) {
        for (int i = 0; i < desc.npins && !status; i++) {
            double target[3];
            carry(step / 60.0, c, desc.x_rest + 3 * pins[i].vertex, target);
            status = cloth_sim_pin(sim, pins[i].vertex, CLOTH_AXIS_ALL, target);
        }
        if (!status) status = cloth_step(sim, 1.0 / 60, &r);
        if (status) fprintf(stderr, "step %d: outcome %d, %d iterations\n", step, (int)r.outcome,
                            r.newton);
        if (status || (status = cloth_sim_stretches(sim, NULL, stretch)) != CLOTH_OK) break;
        ms += r.ms.total, newton += r.newton;
        view_frame(page, cloth_sim_state(sim)->t, cloth_sim_state(sim)->x, stretch);
        if (step % 60 == 0)
            printf("%d s: %.0f ms and %.1f Newton iterations a step, %d collapsed\n", step / 60,
                   ms / step, (double)newton / step, r.collapsed);
    }
    sprintf(caption, "%.120s: cotton knit, %d vertices, %d pinned; step 1/60 s, %.1f Newton "
            "iterations and %.0f ms each; no contact.", name, desc.nv, desc.npins,
            (double)newton / fmax(done, 1), ms / fmax(done, 1));
    view_caption(page, caption);
    error = view_close(page, "out/02_garment.html");
    printf("%d of %d steps solved\n", done, STEPS);
end:
    if (status || error)
        fprintf(stderr, "%s: %s\n", name, error ? error : cloth_status_text(status));
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(&desc.hooks, mesh);
    shapes_shirt_free(&shirt), free(pins), free(stretch);
    return status != CLOTH_OK || error != NULL;
}
