/* test_collide.c - the contact's calls: refusals, handles, a failing allocator, snapshots, what a
 * failed step leaves behind.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_collide.c -lm
 * tier: quick */
#include "../clothsim_collide.h"

#include "test.h"
#include "scene.h"

/* A sheet 8 x 8 over a ball, a plane below. */
typedef struct world {
    cloth_mesh    *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle ball, ground;
} world;

static void world_close(world *w) {
    cloth_collide_destroy(w->c);
    cloth_sim_destroy(w->sim);
    cloth_model_destroy(w->model);
    cloth_mesh_destroy(NULL, w->mesh);
    memset(w, 0, sizeof *w);
}

static cloth_status world_obstacles(world *w) {
    static const double center[3] = {0.1, -0.08, 0.1}, ground[3] = {0, -0.2, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_status        status;
    o.kind = CLOTH_OBSTACLE_SPHERE;
    o.x = center;
    o.radius = 0.06;
    o.friction = 0.1;
    status = cloth_collide_add(w->c, &o, &w->ball);
    o.kind = CLOTH_OBSTACLE_PLANE;
    o.x = ground;
    return status ? status : cloth_collide_add(w->c, &o, &w->ground);
}

static cloth_status world_open(world *w, cloth_integrator integrator, const cloth_hooks *hooks,
                               const cloth_collide_desc *contact) {
    cloth_desc   d = cloth_desc_default();
    cloth_status status;
    memset(w, 0, sizeof *w);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 8, 8, 0.2, 0.2, &w->mesh)) exit(2);
    if (hooks) d.hooks = *hooks;
    d.nv = w->mesh->nv, d.x_rest = w->mesh->x, d.nf = w->mesh->nf, d.faces = w->mesh->faces;
    d.material.membrane = 300;
    d.material.bending = 1e-5;
    d.material.density = 0.2;
    d.integrator = integrator;
    d.contact = CLOTH_CONTACT_SELF;
    status = cloth_model_create(&d, &w->model);
    if (!status) status = cloth_sim_create(w->model, &w->sim);
    if (!status) status = cloth_collide_create(w->sim, contact, &w->c);
    return status ? status : world_obstacles(w);
}

static double world_h(cloth_integrator integrator) {
    return integrator == CLOTH_INTEGRATOR_LEAPFROG ? 1.0 / 480 : 1.0 / 60;
}

/* n steps; the ball moves sideways. */
static int world_run(world *w, int n, double h) {
    int i, ok = 1;
    for (i = 0; i < n; i++) {
        double center[3] = {0.1, -0.08, 0.1};
        center[0] += 0.1 * (cloth_sim_state(w->sim)->t + h);
        ok = cloth_collide_move(w->c, w->ball, center) == CLOTH_OK &&
             cloth_step(w->sim, h, NULL) == CLOTH_OK && ok;
    }
    return ok;
}

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

/* save, 12 steps, restore, 12 steps; and from the start again. */
static void snapshots(void) {
    const cloth_integrator kind[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                      CLOTH_INTEGRATOR_LEAPFROG};
    int k;
    for (k = 0; k < 3; k++) {
        const double h = world_h(kind[k]);
        const int    n = kind[k] == CLOTH_INTEGRATOR_LEAPFROG ? 120 : 20;
        uint64_t     middle, end;
        size_t       size;
        void        *buf;
        int          touches = 0;
        CHECK(world_open(&W, kind[k], NULL, NULL) == CLOTH_OK);
        CHECK(world_run(&W, n, h));
        CHECK(cloth_collide_touches(W.c, 0, NULL, &touches) == CLOTH_OK);
        CHECK(touches > 0);                 /* there is contact to be kept */
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
    RUN(refusals);
    RUN(obstacles);
    RUN(failing_allocator);
    RUN(snapshots);
    RUN(cancel);
    RUN(pinch);
    RUN(weight);
    RUN(exempt);
    return TEST_END();
}
