/* 03_flag.c - a flag of polyester in gusty wind, and the drag that its pole has to bear.
 *
 * Notice: cloth_sim_set_wind() before each step makes gusts (the air has one velocity
 * everywhere: flutter comes from the gusts and the faces' own motion, not from eddies);
 * the equilateral sheet has the least mesh bias; cloth_sim_potential() gives dE/dx, and at a
 * pinned vertex, which does not accelerate, that is the force with which the pole holds it.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 03_flag.c -lm
 *   page:     out/03_flag.html
 *   expected: 240 steps; the flag pulls downwind
 *
 * Exercises: (1) wind_at(): 8 instead of 5 m/s: about twice the drag;
 * (2) desc.lift = 0: no force along the faces: a quarter less drag, and the flag hangs lower;
 * (3) h = 1.0 / 240 and 960 steps: less numerical damping, livelier ripples. */
#include "clothsim.h"
#include "view.h"

/* Velocity of the air, m/s: 5 along x with gusts of up to 2, turning by about 20 degrees. */
static void wind_at(double t, double w[3]) {
    double speed = 5 + 1.3 * sin(2.1 * t) + 0.7 * sin(5.3 * t + 1);
    double angle = 0.25 * sin(3.7 * t) + 0.12 * sin(8.9 * t + 2);
    w[0] = speed * cos(angle), w[1] = 0.3 * sin(4.3 * t), w[2] = speed * sin(angle);
}

int main(void) {
    const double h = 1.0 / 60;
    const int    steps = 240;
    cloth_desc   desc = cloth_desc_default();
    cloth_mesh  *sheet = NULL;
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_pin   *pins = NULL;
    cloth_report r;
    view        *page = NULL;
    const char  *error = NULL;
    double      *grad = NULL, *stretch = NULL, drag = 0, most = 0, w[3];
    int          cloth, pole, newton = 0;
    cloth_status status;
    char         caption[300];
    /* the pole: a square tube from the ground to above the flag */
    const double pole_x[24] = {-0.04, 0, -0.02, -0.01, 0, -0.02, -0.01, 0, 0.02, -0.04, 0, 0.02,
        -0.04, 1.35, -0.02, -0.01, 1.35, -0.02, -0.01, 1.35, 0.02, -0.04, 1.35, 0.02};
    const int pole_faces[30] = {0, 4, 1, 1, 4, 5, 1, 5, 2, 2, 5, 6, 2, 6, 3, 3, 6, 7, 3, 7, 0,
        0, 7, 4, 4, 7, 6, 4, 6, 5};

    desc.hooks.log.fn = cloth_log_stderr;
    status = cloth_mesh_sheet(&desc.hooks, CLOTH_SHEET_EQUILATERAL, 40, 0, 1.5, 1.0, &sheet);
    if (status) goto end;
    pins = (cloth_pin *)malloc((size_t)sheet->nv * sizeof *pins);
    grad = (double *)malloc(3 * (size_t)sheet->nv * sizeof *grad);
    stretch = (double *)malloc((size_t)sheet->nf * sizeof *stretch);
    if (!pins || !grad || !stretch) { error = "out of memory"; goto end; }
    for (int i = 0; i < sheet->nv; i++) {                   /* stand it up, hoist at x = 0 */
        double *x = sheet->x + 3 * i, z = x[2];
        x[2] = x[1], x[1] = 1.3 - z;
        if (x[0] < 1e-9) pins[desc.npins].vertex = i, pins[desc.npins++].axes = CLOTH_AXIS_ALL;
    }
    desc.nv = sheet->nv, desc.x_rest = sheet->x;
    desc.nf = sheet->nf, desc.faces = sheet->faces, desc.X = sheet->X;
    desc.pins = pins;
    desc.material = cloth_material_fabric(CLOTH_FABRIC_POLYESTER);
    desc.integrator = CLOTH_INTEGRATOR_BDF2;                /* Euler would damp the waves */
    desc.tolerance = 1e-3;                                  /* m: enough for a picture */
    desc.wind_on = 1;
    desc.lift = 0.05;                                       /* smooth: little drag along it */
    wind_at(0, desc.wind);
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto end;
    if ((status = cloth_sim_create(model, &sim)) != CLOTH_OK) goto end;

    page = view_open("A flag in gusty wind", "");
    view_camera(page, 10, 8);
    cloth = view_mesh(page, "flag", VIEW_CLOTH, sheet->nv, sheet->nf, sheet->faces);
    view_pattern(page, cloth, sheet->X);
    pole = view_mesh(page, "pole", VIEW_OBSTACLE, 8, 10, pole_faces);
    view_scalar(page, 0, "largest stretch", "m/m", VIEW_FACE, 1.0, 1.0, 1.04);
    for (int step = 1; step <= steps; step++) {
        double pull = 0;
        wind_at(step * h, w);
        if ((status = cloth_sim_set_wind(sim, w)) != CLOTH_OK) goto end;
        if ((status = cloth_step(sim, h, &r)) != CLOTH_OK) goto end;
        if ((status = cloth_sim_potential(sim, cloth_sim_state(sim)->x, NULL, grad)) != CLOTH_OK)
            goto end;
        if ((status = cloth_sim_stretches(sim, NULL, stretch)) != CLOTH_OK) goto end;
        for (int i = 0; i < desc.npins; i++) pull -= grad[3 * pins[i].vertex];
        drag += pull / steps, most = fmax(most, pull), newton += r.newton;
        view_time(page, cloth_sim_state(sim)->t);
        view_put(page, cloth, cloth_sim_state(sim)->x, stretch, NULL);
        if (step == 1) view_put(page, pole, pole_x, NULL, NULL);
    }
    sprintf(caption, "Polyester, 1.5 m x 1 m, %d vertices, step 1/60 s; wind 3 to 7 m/s along x, "
            "turning. The pole bears %.2f N on average, %.2f N at most.", desc.nv, drag, most);
    view_caption(page, caption);
    error = view_close(page, "out/03_flag.html");
    page = NULL;
    printf("drag on the pole: mean %.2f N, most %.2f N; %.1f Newton iterations a step\n", drag,
           most, (double)newton / steps);
    printf("%d steps; the flag pulls %s\n", steps, drag > 0 ? "downwind" : "upwind");
end:
    if (status) fprintf(stderr, "%s\n", cloth_status_text(status));
    if (error) fprintf(stderr, "%s\n", error);
    view_free(page);
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(&desc.hooks, sheet);
    free(pins), free(grad), free(stretch);
    return status != CLOTH_OK || error != NULL;
}
