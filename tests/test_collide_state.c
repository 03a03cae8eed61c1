/* test_collide_state.c - contact from step to step: snapshots, workers, what a failed or a
 * cancelled step leaves behind, pinches, shorter steps, exemptions, groups.
 *   cc -std=c99 -O2 -ffp-contract=off -pthread -DCLOTHSIM_IMPLEMENTATION -I.. \
 *      test_collide_state.c -lm
 * tier: quick */
#include "../clothsim_collide.h"

#include <pthread.h>
#include "test.h"
#include "collide_world.h"

static host  H;
static world W;

/* save, 12 steps, restore, 12 steps; and from the start again. */
static void snapshots(void) {
    const cloth_integrator kind[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                      CLOTH_INTEGRATOR_LEAPFROG};
    int k;
    for (k = 0; k < 3; k++) {
        const double h = world_h(kind[k]);
        int          n = kind[k] == CLOTH_INTEGRATOR_LEAPFROG ? 120 : 20;
        uint64_t     middle, end;
        size_t       size;
        void        *buf;
        int          touches = 0;
        CHECK(world_open(&W, kind[k], NULL, NULL) == CLOTH_OK);
        CHECK(world_run(&W, n, h));
        CHECK(cloth_collide_touches(W.c, 0, NULL, &touches) == CLOTH_OK);
        while (touches == 0 && n < 240) {   /* there is contact to be kept */
            n++;
            CHECK(world_run(&W, 1, h));
            CHECK(cloth_collide_touches(W.c, 0, NULL, &touches) == CLOTH_OK);
        }
        CHECK(touches > 0);
        size = cloth_sim_save_size(W.sim);
        buf = malloc(size);
        CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
        middle = cloth_sim_hash(W.sim);
        CHECK(world_run(&W, n / 2, h));
        end = cloth_sim_hash(W.sim);
        CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_OK);
        CHECK(cloth_sim_hash(W.sim) == middle);
        CHECK(world_run(&W, n / 2, h));
        CHECK(cloth_sim_hash(W.sim) == end);
        CHECK(cloth_sim_reset(W.sim) == CLOTH_OK);
        CHECK(world_run(&W, n, h));
        CHECK(cloth_sim_hash(W.sim) == middle);
        free(buf);
        world_close(&W);
    }
}

static int stop_after;

static int give_up(void *user) {
    (void)user;
    return stop_after-- <= 0;
}

/* Wherever the hook asks to stop, the state is as before. */
static void cancel(void) {
    cloth_hooks hooks = host_hooks(&H);
    uint64_t    before;
    int         asked, stopped = 0;
    hooks.cancel.fn = give_up;
    stop_after = 1 << 30;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 7, 1.0 / 60));
    before = cloth_sim_hash(W.sim);
    for (asked = 0; asked < 200; asked++) {
        cloth_status status;
        stop_after = asked;
        status = cloth_step(W.sim, 1.0 / 60, NULL);
        if (status == CLOTH_OK) break;
        CHECK(status == CLOTH_ERR_CANCELLED && cloth_sim_hash(W.sim) == before);
        stopped++;
    }
    CHECK(stopped > 0 && asked < 200);
    stop_after = 1 << 30;
    world_close(&W);
}

/* Two plates close to less than the cloth needs, and open again. */
static void pinch(void) {
    cloth_hooks         hooks = host_hooks(&H);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_desc          d = cloth_desc_default();
    cloth_collide_pair  pair[8];
    cloth_obstacle      low, high;
    cloth_report        r;
    double              x[24], center[3] = {0.1, -0.052, 0.1}, half[3] = {0.2, 0.05, 0.2};
    int                 i, count, failed = 0, frame;
    memset(&W, 0, sizeof W);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 8, 8, 0.2, 0.2, &W.mesh)) exit(2);
    d.hooks = hooks;
    d.nv = W.mesh->nv, d.x_rest = W.mesh->x, d.nf = W.mesh->nf, d.faces = W.mesh->faces;
    d.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
    CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, NULL, &W.c) == CLOTH_OK);
    o.kind = CLOTH_OBSTACLE_BOX;
    o.x = x;
    cloth_obstacle_box(center, half, NULL, x);
    CHECK(cloth_collide_add(W.c, &o, &low) == CLOTH_OK);
    center[1] = 0.06;
    cloth_obstacle_box(center, half, NULL, x);
    CHECK(cloth_collide_add(W.c, &o, &high) == CLOTH_OK);
    for (frame = 0; frame < 40; frame++) {  /* the upper one: 0.01 above, down to -0.0015, back */
        const double   gap = frame < 20 ? 0.01 - 0.000575 * frame
                                             : -0.0015 + 0.000575 * (frame - 20);
        const uint64_t before = cloth_sim_hash(W.sim);
        uint64_t       after;
        center[1] = 0.05 + gap;
        cloth_obstacle_box(center, half, NULL, x);
        CHECK(cloth_collide_move(W.c, high, x) == CLOTH_OK);
        i = cloth_step(W.sim, 1.0 / 60, &r) != CLOTH_OK;
        after = cloth_sim_hash(W.sim);
        if (i) {
            CHECK(r.status == CLOTH_ERR_STEP && r.outcome == CLOTH_STEP_COLLISION_FAILED);
            CHECK(r.failed_pairs > 0);
            CHECK(cloth_collide_failed(W.c, 8, pair, &count) == CLOTH_OK && count > 0);
            CHECK(pair[0].obstacle.id == low.id || pair[0].obstacle.id == high.id);
            CHECK(after != before || frame == 0 || failed > 0);     /* the target is state */
        }
        failed += i;
    }
    CHECK(failed > 0 && failed < 20 && r.status == CLOTH_OK);
    world_close(&W);
    CHECK(H.live == 0);
}

/* A ball through the sheet: listed, counted, let pass, guarded again when it has left. */
static void exempt(void) {
    cloth_collide_desc d = cloth_collide_desc_default();
    cloth_report       r;
    double             through[3] = {0.1, 0, 0.1}, below[3] = {0.1, -0.08, 0.1};
    double             above[3] = {0.1, 0.3, 0.1};
    int                i;
    d.initial = CLOTH_INITIAL_EXEMPT;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, &d) == CLOTH_OK);
    CHECK(cloth_sim_set_gravity(W.sim, NULL) != CLOTH_OK || 1);
    CHECK(cloth_collide_teleport(W.c, W.ball, through) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-3, &r) == CLOTH_OK && r.exempt_pairs > 0);
    CHECK(cloth_collide_move(W.c, W.ball, above) == CLOTH_OK);
    for (i = 0; i < 3; i++) CHECK(cloth_step(W.sim, 1e-3, &r) == CLOTH_OK);
    CHECK(r.exempt_pairs == 0);
    CHECK(cloth_collide_teleport(W.c, W.ball, below) == CLOTH_OK);
    for (i = 0; i < 20; i++) CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_OK);
    CHECK(r.contacts > 0 && r.exempt_pairs == 0);
    world_close(&W);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(snapshots);
    RUN(cancel);
    RUN(pinch);
    RUN(exempt);
    return TEST_END();
}
