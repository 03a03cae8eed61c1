/* 18_gradient.c - the quick start of gradients: what moves the free corner of a sheet.
 *
 * Notice: the tape is there before the first step; the loss says dL/dx alone, never L; one call
 * returns one number for the stiffness, 1200 for the first velocities, and whether to trust them.
 * Without its lines that say view this is word for word section [1.1] of clothsim_grad.h.
 *
 * The page shows dL/dv0y: m that the corner ends higher for each m/s that a vertex starts upwards
 * with. The sheet is as stiff as card and begins with waves of 4 cm: nothing buckles. With the
 * default bending, 1e-5, it does as it falls, and another order of the unknowns, which changes
 * last bits only, ends 1e-5 m away with dL/dY = 4.25e-5 for 4.29e-5, both as differences say. Laid
 * flat as well (0.04 -> 0) rounding pushes first: dL/dv0y of a vertex is -25 s, and right, for
 * differences give -25.5 at 1e-8 m/s, but -12.8 at 1e-5 and -0.26 at 1e-2. A derivative does not
 * say how far it holds, nor what its run hung on. As it stands dL/dY is the same to 5 digits by
 * differences over 0.8 N/m, and in two orders of the unknowns.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. 18_gradient.c -lm
 *   page:     out/18_gradient.html
 *   expected: dL/dY = 4.549e-05 m per N/m, dL/dv0y of that corner = -0.0002 s; valid
 *
 * Exercises: (1) desc.tolerance = 1e-4, the default: how many digits of the gradient are left, and
 * what does report.early say? (2) membrane 50 instead of 500: a softer sheet crumples where it
 * swings through; does the gradient by v0 grow? (3) grad.gravity, three doubles: compare its y with
 * a run at 9.82 m/s^2. (4) the sheet laid flat, of bending 1e-5: whose v0 moves the corner most?
 */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_grad.h"
#include "view.h"
#include <stdio.h>

enum { NV = 400, STEPS = 30 };
static double view_x[STEPS + 1][3 * NV], view_s[NV];

static void corner(int k, const double *x, const double *v, double *gx, double *gv,
                   void *user) {                       // L = its y after the last step
    (void)x, (void)v, (void)gv, (void)user;
    if (k == STEPS) gx[3 * (NV - 1) + 1] += 1;
}

int main(void) {
    static double     v0[3 * NV];
    double            stiffness;
    cloth_mesh       *sheet = NULL;
    cloth_model      *model = NULL;
    cloth_sim        *sim = NULL;
    cloth_tape       *tape = NULL;
    cloth_grad        grad = {0};
    cloth_grad_report report;
    cloth_pin         pins[2] = {{0, CLOTH_AXIS_ALL}, {19, CLOTH_AXIS_ALL}};
    cloth_desc        desc = cloth_desc_default();
    int               frame, v;
    view             *page = view_open("What moves the corner", "");

    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 20, 20, 1.0, 1.0, &sheet)) return 1;
    for (v = 0; v < NV; v++)                            // laid flat, rounding would choose
        sheet->x[3 * v + 1] = 0.04 * sin(5 * sheet->x[3 * v] + 3 * sheet->x[3 * v + 2]);
    cloth_desc_set_mesh(&desc, sheet);                  // where it buckles
    desc.npins = 2, desc.pins = pins;
    desc.material.bending = 1e-3;                       // N m: what is softer wrinkles
    desc.tolerance = 1e-8;                              // m: derivatives want more than eyes
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) return 1;
    if (cloth_tape_create(sim, NULL, &tape)) return 1;
    view_mesh(page, "sheet", VIEW_CLOTH, sheet->nv, sheet->nf, sheet->faces);
    view_scalar(page, 0, "dL/dv0y", "s", VIEW_VERTEX, -0.07, 0, 0.07), view_camera(page, 28, 40);
    memcpy(view_x[0], cloth_sim_state(sim)->x, sizeof view_x[0]);
    for (frame = 0; frame < STEPS; frame++)
        if (cloth_step(sim, 1.0 / 60, NULL)) return 1;
        else memcpy(view_x[frame + 1], cloth_sim_state(sim)->x, sizeof view_x[0]);
    grad.membrane = &stiffness, grad.v0 = v0;           // what is asked for
    if (cloth_grad_backward(tape, corner, NULL, &grad, &report)) return 1;
    for (frame = 0; frame < NV; frame++) view_s[frame] = v0[3 * frame + 1];
    for (frame = 0; frame <= STEPS; frame++)            // view
        view_frame(page, frame / 60.0, view_x[frame], view_s);
    view_caption(page, "1 m x 1 m, two corners pinned; L: height of a free one after 0.5 s.");
    if (view_close(page, "out/18_gradient.html")) return 1;
    printf("dL/dY = %.3e m per N/m, dL/dv0y of that corner = %.4f s; %s\n", stiffness,
           v0[3 * (NV - 1) + 1], report.valid ? "valid" : report.why);
    cloth_tape_destroy(tape), cloth_sim_destroy(sim), cloth_model_destroy(model);
    cloth_mesh_destroy(NULL, sheet);
    return 0;
}
