/* 15_pinch.c - two plates close on a sheet until it has no room, and open again.
 *
 * Notice: a sheet keeps t/4, 0.5 mm, from each plate. A whole step in which they close below that
 * fails: cloth_step() then returns a status and leaves the state as it was; report.outcome and
 * cloth_collide_failed() say why and where. What begins nearer keeps nearly what it has, so shorter
 * steps get on: cloth_collide_last() tells what part of the way each went, here five of them, and
 * then the sheet fits, 0.19 mm from either plate. The host goes on: it moves the plates as it
 * likes, and when they have opened the cloth comes along. Two parts of ONE body that close so are
 * another matter: they carry what is between them (16_walk.c).
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 15_pinch.c -lm
 *   page:     out/15_pinch.html
 *   expected: some steps cut short: yes; whole again at the end: yes; pairs that intersect: 0
 *
 * Exercises: (1) CLOSED = 0.006: no step fails; (2) HALVINGS = 0: 16 steps fail, as long as the
 * plates are closed; (3) how.thickness = 4e-3: seven steps go part of their way, not five.
 */
#include "clothsim_collide.h"
#include "view.h"
#include <stdio.h>

#define N        20
#define FRAMES   90
#define OPEN     0.06               /* m, between the plates                            */
#define CLOSED   0.0004             /* less than twice the separation t/4 of detection  */
#define HALVINGS 4

static void print_log(cloth_log_level level, cloth_status status, const char *text, void *user) {
    if (level < CLOTH_LOG_INFO && !(*(int *)user)++)    /* the first of many alike */
        fprintf(stderr, "%s (%s)\n", text, cloth_status_text(status));
}

/* Distance of the plates at frame i: closes until 30, stays, opens from 45 to 70. */
static double distance(int i) {
    double s = i < 45 ? fmin(i / 30.0, 1) : fmax((70 - i) / 25.0, 0);
    return OPEN + (CLOSED - OPEN) * s;
}

/* Corners of the lower (side -1) or upper (1) plate, 2 cm thick. */
static void plate(int side, double gap, double *x) {
    double center[3] = {0.5, 0, 0.5}, half[3] = {0.2, 0.01, 0.2};
    center[1] = side * (0.5 * gap + half[1]);
    cloth_obstacle_box(center, half, NULL, x);
}

int main(void) {
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc box = cloth_obstacle_desc_default();
    cloth_mesh         *sheet = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *contact = NULL;
    cloth_collide_desc  how = cloth_collide_desc_default();
    cloth_obstacle      id[2];
    cloth_pin           pins[4] = {{0, 7}, {N - 1, 7}, {N * (N - 1), 7}, {N * N - 1, 7}};
    cloth_status        status = CLOTH_OK;
    double              x[2][24], f[3 * N * N], size[N * N];
    int                 failed = 0, none = 0, first = 0, last = 0, pairs = 0, said = 0;
    const char         *error = NULL;
    view               *page = NULL;
    desc.hooks.log.fn = print_log, desc.hooks.log.user = &said;
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, 1.0, 1.0, &sheet);
    if (status) goto end;
    desc.nv = sheet->nv, desc.x_rest = sheet->x;
    desc.nf = sheet->nf, desc.faces = sheet->faces;
    desc.npins = 4, desc.pins = pins;
    desc.contact = CLOTH_CONTACT_SELF;
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto end;
    if ((status = cloth_sim_create(model, &sim)) != CLOTH_OK) goto end;
    if ((status = cloth_collide_create(sim, &how, &contact)) != CLOTH_OK) goto end;
    page = view_open("A pinch that fails and recovers", "Two plates close to 0.4 mm on a sheet "
        "that keeps 0.5 mm from each, wait, and open. Five steps go part of their way.");
    view_camera(page, 25, 6);
    view_mesh(page, "sheet", VIEW_CLOTH, sheet->nv, sheet->nf, sheet->faces);
    view_scalar(page, 0, "contact force", "N", VIEW_VERTEX, 0, 0, 0.2);
    for (int side = 0; side < 2; side++) {
        static const int faces[36] = {0,4,6, 0,6,2, 1,3,7, 1,7,5, 0,1,5, 0,5,4,
                                      2,6,7, 2,7,3, 0,2,3, 0,3,1, 4,5,7, 4,7,6};
        box.kind = CLOTH_OBSTACLE_BOX, box.x = x[side];
        plate(2 * side - 1, OPEN, x[side]);
        if ((status = cloth_collide_add(contact, &box, id + side)) != CLOTH_OK) goto end;
        view_mesh(page, side ? "upper plate" : "lower plate", VIEW_OBSTACLE, 8, 12, faces);
    }
    for (int i = 1; i <= FRAMES; i++) {
        cloth_report         r;
        cloth_collide_pair   pair;
        cloth_collide_report c;
        for (int side = 0; side < 2; side++) {
            plate(2 * side - 1, distance(i), x[side]);
            if ((status = cloth_collide_move(contact, id[side], x[side])) != CLOTH_OK) goto end;
        }
        status = cloth_collide_step(contact, 1.0 / 60, HALVINGS, &r);
        c = cloth_collide_last(contact);
        if (status && r.outcome == CLOTH_STEP_NONE) goto end;   /* misuse, not contact */
        if (status || c.fraction < 0.999) {
            if (++failed == 1) first = i;
            last = i, none += status != CLOTH_OK;
            cloth_collide_failed(contact, 1, &pair, &pairs);
            if (none == 1 && status)
                printf("frame %d, plates asked to %.2f mm: outcome %d, %d pairs, the first: "
                       "vertex, edge or face %d of the sheet\n", i, 1e3 * distance(i),
                       (int)r.outcome, pairs, pair.reversed ? pair.b : pair.a);
        }
        if ((status = cloth_collide_forces(contact, f)) != CLOTH_OK) goto end;
        for (int v = 0; v < N * N; v++)
            size[v] = sqrt(pow(f[3 * v], 2) + pow(f[3 * v + 1], 2) + pow(f[3 * v + 2], 2));
        view_frame(page, i / 60.0, cloth_sim_state(sim)->x, size);
        view_put(page, 1, x[0], NULL, NULL), view_put(page, 2, x[1], NULL, NULL);
    }
    printf("%d steps went part of their way, %d failed: frames %d to %d\n", failed - none, none,
           first, last);
    error = view_close(page, "out/15_pinch.html");
    page = NULL;
    status = cloth_collide_intersections(contact, 0, NULL, &pairs);
    printf("some steps cut short: %s; whole again at the end: %s; pairs that intersect: %d\n",
           failed ? "yes" : "no", last < FRAMES ? "yes" : "no", pairs);
end:
    if (status || error) fprintf(stderr, "%s\n", error ? error : cloth_status_text(status));
    view_free(page);
    cloth_collide_destroy(contact), cloth_sim_destroy(sim);
    cloth_model_destroy(model), cloth_mesh_destroy(NULL, sheet);
    return status != CLOTH_OK || error != NULL;
}
