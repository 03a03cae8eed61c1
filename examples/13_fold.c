/* 13_fold.c - a sheet folded onto itself by its edge, and three that fall in a heap.
 *
 * Notice: one model may hold several cloths (cloth_mesh_merge(), each a part); under
 * CLOTH_CONTACT_SELF parts collide with each other and with themselves. Pins that move lead the
 * edge over and are let go by cloth_sim_unpin(). A layer rests a little under t above what is
 * below it.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 13_fold.c -lm
 *   page:     out/13_fold.html
 *   expected: 80 of 80 steps solved; a smallest gap over 0.5 mm: yes; pairs that intersect: 0
 *
 * Exercises: (1) BENDING = 1e-3: the fold does not lie flat, it stays a tube 73 mm high; (2)
 * desc.contact = CLOTH_CONTACT_OBSTACLES: the layers sink into each other, 3.5 mm of heap instead
 * of 8.6; no pair is counted, for plane and ball have no faces: their gap tells; (3)
 * contact.friction = floor.friction = ball.friction = 0: what lies on what slides.
 */
#include "clothsim_collide.h"
#include "view.h"
#include <stdio.h>

#define N       12                  /* vertices along a side                            */
#define LAYERS  3
#define FRAMES  80
#define BENDING 1e-5                /* N m                                              */

/* The edge from the end (x = 0.5) over to x = 0.1 in a half circle, in the first second. */
static void lead(double t, double z, double *x) {
    double s = fmin(t, 1), turn = 3.14159265 * s * s * (3 - 2 * s);
    x[0] = 0.27 + 0.23 * cos(turn);
    x[1] = 0.002 + 0.012 * s + 0.2 * sin(turn);
    x[2] = z;
}

int main(void) {
    static const char  *name[1 + LAYERS] = {"fold", "heap, lowest", "middle", "highest"};
    cloth_desc          desc = cloth_desc_default();
    cloth_collide_desc  contact = cloth_collide_desc_default();
    cloth_obstacle_desc floor = cloth_obstacle_desc_default(), ball = floor;
    cloth_mesh         *sheet[1 + LAYERS] = {NULL}, *all = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *collide = NULL;
    cloth_obstacle      id;
    cloth_pin           pins[N];
    cloth_status        status = CLOTH_OK;
    const double        origin[3] = {0, 0, 0}, center[3] = {0.9, 0, 0.25}, radius = 0.1;
    double              top = 0, gap = 0, x[3];
    int                 frame, done = 0, pairs = 0;
    const char         *error = NULL;
    view               *page = NULL;
    for (int k = 0; k <= LAYERS && !status; k++) {
        double side = k > 0 ? 0.4 : 0.5, turn = 0.4 * k;
        status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, side, side, sheet + k);
        for (int i = 0; !status && i < sheet[k]->nv; i++) {
            double *p = sheet[k]->x + 3 * i, u = p[0] - 0.2, v = p[2] - 0.2;
            if (k == 0) p[1] += 0.002;
            else p[0] = 0.9 + u * cos(turn) - v * sin(turn), p[1] = 0.09 + 0.04 * k,
                 p[2] = 0.25 + u * sin(turn) + v * cos(turn);
        }
    }
    if (!status) status = cloth_mesh_merge(NULL, sheet, 1 + LAYERS, &all);
    if (status) goto end;
    for (int i = 0; i < N; i++) pins[i].vertex = N * i + N - 1, pins[i].axes = CLOTH_AXIS_ALL;
    desc.nv = all->nv, desc.x_rest = all->x, desc.X = all->X;
    desc.nf = all->nf, desc.faces = all->faces, desc.part = all->part;
    desc.npins = N, desc.pins = pins;
    desc.material.bending = BENDING;
    desc.contact = CLOTH_CONTACT_SELF;
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto end;
    if ((status = cloth_sim_create(model, &sim)) != CLOTH_OK) goto end;
    if ((status = cloth_collide_create(sim, &contact, &collide)) != CLOTH_OK) goto end;
    floor.kind = CLOTH_OBSTACLE_PLANE, floor.x = origin, floor.normal[1] = 1;
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = radius;
    if ((status = cloth_collide_add(collide, &floor, &id)) != CLOTH_OK) goto end;
    if ((status = cloth_collide_add(collide, &ball, &id)) != CLOTH_OK) goto end;
    page = view_open("A fold and a heap", "The edge of one sheet is led over and let go; three "
        "sheets fall onto half a ball. Contact 2 mm, friction 0.3.");
    view_camera(page, 20, 22), view_floor(page, 0);
    for (int k = 0; k <= LAYERS; k++)
        view_pattern(page, view_mesh(page, name[k], VIEW_CLOTH, sheet[k]->nv, sheet[k]->nf,
                                     sheet[k]->faces), sheet[k]->X);
    view_ball(page, "ball");
    for (frame = 1; frame <= FRAMES; frame++, done++) {
        double t = frame / 60.0;
        for (int i = 0; i < N && !status && t <= 1.1; i++) {
            lead(t, desc.x_rest[3 * pins[i].vertex + 2], x);
            status = t > 1.05 ? cloth_sim_unpin(sim, pins[i].vertex)
                              : cloth_sim_pin(sim, pins[i].vertex, CLOTH_AXIS_ALL, x);
        }
        if (!status) status = cloth_step(sim, 1.0 / 60, NULL);
        if (status) break;
        view_time(page, t);
        for (int k = 0, at = 0; k <= LAYERS; at += sheet[k++]->nv)
            view_put(page, k, cloth_sim_state(sim)->x + 3 * at, NULL, NULL);
        view_put_ball(page, 1 + LAYERS, center, radius - 0.001);
    }
    for (int i = sheet[0]->nv; i < all->nv; i++)
        top = fmax(top, cloth_sim_state(sim)->x[3 * i + 1]);
    printf("highest point of the heap: %.1f mm above the ball\n", 1e3 * (top - radius));
    error = view_close(page, "out/13_fold.html");
    if (!status) status = cloth_collide_gap(collide, 0.01, &gap);
    if (!status) status = cloth_collide_intersections(collide, 0, NULL, &pairs);
    printf("%d of %d steps solved; a smallest gap over 0.5 mm: %s; pairs that intersect: %d\n",
           done, FRAMES, gap > 0.5e-3 ? "yes" : "no", pairs);
end:
    if (status || error) fprintf(stderr, "%s\n", error ? error : cloth_status_text(status));
    cloth_collide_destroy(collide), cloth_sim_destroy(sim);
    cloth_model_destroy(model), cloth_mesh_destroy(NULL, all);
    for (int k = 0; k <= LAYERS; k++) cloth_mesh_destroy(NULL, sheet[k]);
    return status != CLOTH_OK || error != NULL;
}
