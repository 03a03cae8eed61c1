/* test_collide.c - the contact's calls: refusals, handles, a failing allocator, snapshots, what a
 * failed step leaves behind.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_collide.c -lm
 * tier: quick */
#include "../clothsim_collide.h"

#include "test.h"
#include "collide_world.h"

static host  H;
static world W;

static int said(cloth_status status, cloth_status want, const char *what) {
    const int ok = status == want && H.errors == 1 && strstr(H.text, what) != NULL;
    if (!ok) printf("    status %d, %d sentences: %s\n", (int)status, H.errors, H.text);
    host_forget(&H);
    return ok;
}

static int desc_refused(const cloth_collide_desc *d, cloth_status want, const char *what) {
    cloth_collide  *c = NULL;
    const int       live = H.live;
    cloth_status    status = cloth_collide_create(W.sim, d, &c);
    return said(status, want, what) && c == NULL && H.live == live;
}

static void refusals(void) {
    cloth_hooks         hooks = host_hooks(&H);
    cloth_collide_desc  d;
    cloth_collide      *c = NULL;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    d = cloth_collide_desc_default();
    CHECK(desc_refused(&d, CLOTH_ERR_ARGUMENT, "has a contact already"));
    cloth_collide_destroy(W.c);
    W.c = NULL;
#define REFUSE(field, value, status, what)                                                       \
    d = cloth_collide_desc_default();                                                            \
    d.field = value;                                                                             \
    CHECK(desc_refused(&d, status, what))
    REFUSE(thickness, 0, CLOTH_ERR_ARGUMENT, "collide.thickness = 0");
    REFUSE(thickness, NAN, CLOTH_ERR_NONFINITE, "collide.thickness = NaN");
    REFUSE(stiffness, -1, CLOTH_ERR_ARGUMENT, "collide.stiffness = -1");
    REFUSE(relaxation, -2, CLOTH_ERR_ARGUMENT, "collide.relaxation = -2");
    REFUSE(friction, INFINITY, CLOTH_ERR_NONFINITE, "collide.friction = inf");
    REFUSE(slip, 0, CLOTH_ERR_ARGUMENT, "collide.slip = 0");
    REFUSE(max_push, 0, CLOTH_ERR_ARGUMENT, "collide.max_push = 0");
    REFUSE(max_passes, 0, CLOTH_ERR_ARGUMENT, "collide.max_passes = 0");
    REFUSE(initial, (cloth_initial)7, CLOTH_ERR_ARGUMENT, "collide.initial = 7");
    REFUSE(nparts, 3, CLOTH_ERR_ARGUMENT, "collide.nparts = 3");
    d.cookie = 0;
    CHECK(cloth_collide_create(W.sim, &d, &c) == CLOTH_ERR_UNINIT && !c);
    CHECK(cloth_collide_create(NULL, NULL, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(cloth_collide_create(W.sim, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    world_close(&W);
    CHECK(H.live == 0);
}

static int add_refused(const cloth_obstacle_desc *o, cloth_status want, const char *what) {
    const uint64_t before = cloth_sim_hash(W.sim);
    cloth_obstacle id = {7};
    int            live;
    (void)cloth_collide_add(W.c, o, NULL);      /* lists may have grown once */
    host_forget(&H);
    live = H.live;
    return said(cloth_collide_add(W.c, o, &id), want, what) && id.id == 0 && H.live == live &&
           cloth_sim_hash(W.sim) == before;
}

static void obstacles(void) {
    static const double x[9] = {0, -0.3, 0, 1, -0.3, 0, 0, -0.3, 1}, bad[3] = {0, NAN, 0};
    static const int    faces[3] = {0, 2, 1}, wrong[3] = {0, 2, 9};
    static const double inside[3] = {0.1, 0.01, 0.1};
    cloth_hooks         hooks = host_hooks(&H);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id, stale;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    o.nv = 3, o.nf = 1, o.x = x, o.faces = wrong;
    CHECK(add_refused(&o, CLOTH_ERR_MESH, "9"));
    o.faces = NULL;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "faces NULL"));
    o.faces = faces, o.nf = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.nf = 0"));
    o.nf = 1, o.friction = -1;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.friction = -1"));
    o.friction = 0.3, o.kind = (cloth_obstacle_kind)9;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.kind = 9"));
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.radius = 0"));
    o.radius = 0.1, o.x = bad;
    CHECK(add_refused(&o, CLOTH_ERR_NONFINITE, "obstacle.x[1] = NaN"));
    o.x = inside;                           /* the sheet runs through it */
    CHECK(add_refused(&o, CLOTH_ERR_MESH, "intersect before the step"));
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = x, o.normal[1] = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.normal"));
    o.cookie = 0;
    CHECK(cloth_collide_add(W.c, &o, &id) == CLOTH_ERR_UNINIT);
    CHECK(said(cloth_collide_move(W.c, W.ball, bad), CLOTH_ERR_NONFINITE, "x[1] = NaN"));
    CHECK(said(cloth_collide_move(W.c, W.ball, NULL), CLOTH_ERR_ARGUMENT, "NULL"));
    CHECK(said(cloth_collide_teleport(W.c, W.ball, inside), CLOTH_ERR_MESH, "intersect"));
    CHECK(said(cloth_collide_step(W.c, 0.01, 99, NULL), CLOTH_ERR_ARGUMENT, "halvings = 99"));
    o = cloth_obstacle_desc_default();
    o.nv = 3, o.nf = 1, o.x = x, o.faces = faces;
    CHECK(cloth_collide_add(W.c, &o, &id) == CLOTH_OK && id.id != 0);
    stale = id;
    CHECK(cloth_collide_remove(W.c, id) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, stale) == CLOTH_ERR_HANDLE);
    CHECK(cloth_collide_add(W.c, &o, &id) == CLOTH_OK && id.id != stale.id);
    CHECK(cloth_collide_move(W.c, stale, x) == CLOTH_ERR_HANDLE);
    CHECK(cloth_collide_teleport(W.c, stale, x) == CLOTH_ERR_HANDLE);
    CHECK(world_run(&W, 3, 1.0 / 60));
    world_close(&W);
    CHECK(H.live == 0);
}

/* Every allocation of create, add and the first steps fails in turn; nothing is lost. */
static void failing_allocator(void) {
    cloth_hooks hooks = host_hooks(&H);
    int         at, made;
    int         refused = 0;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 8, 1.0 / 60));
    made = H.calls;
    world_close(&W);
    for (at = 1; at <= made; at += test_quick() ? 7 : 1) {
        cloth_status status;
        int          i;
        hooks = host_hooks(&H);
        H.fail_at = at;
        status = world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL);
        for (i = 0; i < 8 && !status; i++) {
            const uint64_t before = cloth_sim_hash(W.sim);
            status = cloth_step(W.sim, 1.0 / 60, NULL);
            if (status) CHECK(cloth_sim_hash(W.sim) == before);
        }
        refused += status == CLOTH_ERR_MEMORY;
        CHECK(status == CLOTH_OK || status == CLOTH_ERR_MEMORY);
        world_close(&W);
        CHECK(H.live == 0);
    }
    CHECK(refused > 20);
}

/* At rest on the ground the touches carry the sheet. */
static void weight(void) {
    cloth_touch touch[400];
    double     *f, sum = 0, sum_f = 0, gap;
    double      away[3] = {5, 5, 5};
    int         i, count;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_collide_teleport(W.c, W.ball, away) == CLOTH_OK);
    for (i = 0; i < 150; i++) CHECK(cloth_step(W.sim, 1.0 / 60, NULL) == CLOTH_OK);
    CHECK(cloth_collide_touches(W.c, 400, touch, &count) == CLOTH_OK);
    for (i = 0; i < count && i < 400; i++) {
        sum += touch[i].force * touch[i].normal[1];
        CHECK(touch[i].obstacle.id == W.ground.id && touch[i].n == 1);
    }
    f = (double *)calloc(3 * (size_t)W.mesh->nv, sizeof(double));
    CHECK(f && cloth_collide_forces(W.c, f) == CLOTH_OK);
    for (i = 0; f && i < W.mesh->nv; i++) sum_f += f[3 * i + 1];
    CHECK_REL(sum, 0.2 * 0.04 * 9.81, 0.01);
    CHECK_REL(sum_f, sum, 1e-12);
    CHECK(cloth_collide_gap(W.c, 0.05, &gap) == CLOTH_OK && gap > 0.5e-3 && gap < 2e-3);
    CHECK(cloth_collide_intersections(W.c, 0, NULL, &count) == CLOTH_OK && count == 0);
    free(f);
    world_close(&W);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(refusals);
    RUN(obstacles);
    RUN(failing_allocator);
    RUN(weight);
    return TEST_END();
}
