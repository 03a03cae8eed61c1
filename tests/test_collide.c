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
    cloth_collide_part  part;
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
    REFUSE(max_passes, 0, CLOTH_ERR_ARGUMENT, "collide.max_passes = 0");
    REFUSE(initial, (cloth_initial)7, CLOTH_ERR_ARGUMENT, "collide.initial = 7");
    REFUSE(thickness, INFINITY, CLOTH_ERR_NONFINITE, "collide.thickness = inf");
    REFUSE(stiffness, NAN, CLOTH_ERR_NONFINITE, "collide.stiffness = NaN");
    REFUSE(relaxation, NAN, CLOTH_ERR_NONFINITE, "collide.relaxation = NaN");
    REFUSE(friction, -0.5, CLOTH_ERR_ARGUMENT, "collide.friction = -0.5");
    REFUSE(slip, NAN, CLOTH_ERR_NONFINITE, "collide.slip = NaN");
    REFUSE(max_passes, -3, CLOTH_ERR_ARGUMENT, "collide.max_passes = -3");
    REFUSE(nparts, 3, CLOTH_ERR_ARGUMENT, "collide.nparts = 3");
    REFUSE(nparts, 1, CLOTH_ERR_ARGUMENT, "parts is NULL");
    memset(&part, 0, sizeof part);
    part.friction = -0.5;
    d.nparts = 1, d.parts = &part;
    CHECK(desc_refused(&d, CLOTH_ERR_ARGUMENT, "collide.parts[0].friction = -0.5"));
    part.friction = NAN;
    CHECK(desc_refused(&d, CLOTH_ERR_NONFINITE, "collide.parts[0].friction = NaN"));
    d.cookie = 0;
    CHECK(desc_refused(&d, CLOTH_ERR_UNINIT, "cloth_collide_desc_default()"));
    CHECK(cloth_collide_create(NULL, NULL, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(cloth_collide_create(W.sim, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    world_close(&W);
    CHECK(H.live == 0);
}

/* No contact for this model, for cloth that intersects itself, with ties or without. */
static void models(void) {
    cloth_hooks    hooks = host_hooks(&H);
    cloth_desc     d = cloth_desc_default();
    cloth_tie      tie;
    cloth_collide *c = NULL;
    const double   x[18] = {0, 0, 0, 1, 0, 0, 0, 0, 1,
                            0.2, -0.5, 0.2, 0.3, 0.5, 0.2, 0.2, 0.5, 0.3};
    const int      faces[6] = {0, 2, 1, 3, 4, 5};
    int            k;
    memset(&tie, 0, sizeof tie);
    tie.leader = 0, tie.follower = 1, tie.axes = CLOTH_AXIS_Y;
    for (k = 0; k < 3; k++) {
        memset(&W, 0, sizeof W);
        d = cloth_desc_default();
        d.hooks = hooks;
        d.nv = 6, d.x_rest = x, d.nf = 2, d.faces = faces;
        d.contact = k == 0 ? CLOTH_CONTACT_NONE : CLOTH_CONTACT_SELF;
        d.ties = &tie, d.nties = k == 1;
        CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
        CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
        host_forget(&H);
        if (k == 0) CHECK(desc_refused(NULL, CLOTH_ERR_UNSUPPORTED, "CLOTH_CONTACT_NONE"));
        if (k > 0) {
            cloth_collide_desc exempt = cloth_collide_desc_default();
            int                pair[4] = {-1, -1, -1, -1}, count = 0;
            CHECK(desc_refused(NULL, CLOTH_ERR_MESH, "1 pairs intersect or touch before the step; "
                                                     "the first: cloth's face 0 and face"));
            exempt.initial = CLOTH_INITIAL_EXEMPT;
            CHECK(cloth_collide_create(W.sim, &exempt, &c) == CLOTH_OK);
            CHECK(cloth_collide_intersections(c, 2, pair, &count) == CLOTH_OK && count == 1);
            CHECK(pair[0] == 0 && pair[1] == 1 && pair[2] == -1);
            cloth_collide_destroy(c);
        }
        world_close(&W);
        CHECK(H.live == 0);
    }
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
    cloth_report        r;
    static const int    faces[3] = {0, 2, 1}, wrong[3] = {0, 2, 9};
    static const double corner[12] = {0, -5, 0, 1, -5, 0, 0, -4, 0, 0, -5, 1};
    static const int    sides[12] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 2, 3};   /* one turned */
    static const double inside[3] = {0.1, 0.01, 0.1}, low[3] = {0.11, -0.01, 0.12};
    cloth_hooks         hooks = host_hooks(&H);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id, stale;
    double              skewer[6];
    int                 k;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    o.nv = 3, o.nf = 1, o.x = x, o.faces = wrong;
    CHECK(add_refused(&o, CLOTH_ERR_MESH, "9"));
    o.faces = NULL;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.faces is NULL"));
    o.faces = faces, o.nf = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.nf = 0"));
    o.nf = 1, o.nv = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.nv = 0"));
    o.nv = 0x7fffffff;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.nv = 2147483647"));
    o.nv = 3, o.x = NULL;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.x is NULL"));
    o.x = x, o.friction = NAN;
    CHECK(add_refused(&o, CLOTH_ERR_NONFINITE, "obstacle.friction = NaN"));
    o.faces = faces, o.friction = -1;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.friction = -1"));
    o.friction = 1e6;                       /* made 10 J of 1e-4 */
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.friction = 1e6"));
    o.friction = 0.3, o.kind = (cloth_obstacle_kind)9;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.kind = 9"));
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.radius = 0"));
    o.radius = NAN;
    CHECK(add_refused(&o, CLOTH_ERR_NONFINITE, "obstacle.radius = NaN"));
    o.kind = CLOTH_OBSTACLE_CAPSULE, o.radius = -1;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.radius = -1"));
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0.1, o.x = bad;
    CHECK(add_refused(&o, CLOTH_ERR_NONFINITE, "obstacle.x[1] = NaN"));
    o.x = low, o.radius = 1e4;              /* arrivals are known to 1e-6 of it: a centimetre */
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.radius = 10000"));
    o.radius = 0.0105;
    CHECK(add_refused(&o, CLOTH_ERR_MESH, "and vertex 0 of an obstacle"));
    o.radius = 0.1, o.thickness = 1e-18;    /* the third step had no gap */
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.thickness = 1e-18"));
    o.thickness = 1e20;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.thickness = 1e20"));
    o.thickness = 0;
    o.x = inside;                           /* the sheet runs through it */
    CHECK(add_refused(&o, CLOTH_ERR_MESH, "intersect or touch before the step"));
    for (k = 0; k < 6; k++) {               /* through the middle of a face */
        const int *f = W.mesh->faces + 3 * 20;
        skewer[k] = (W.mesh->x[3 * f[0] + k % 3] + W.mesh->x[3 * f[1] + k % 3] +
                     W.mesh->x[3 * f[2] + k % 3]) / 3 + (k == 1 ? -0.01 : k == 4 ? 0.01 : 0);
    }
    o.kind = CLOTH_OBSTACLE_CAPSULE, o.x = skewer, o.radius = 1e-4;
    CHECK(add_refused(&o, CLOTH_ERR_MESH, "intersect or touch before the step"));
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = x, o.normal[1] = 0;
    CHECK(add_refused(&o, CLOTH_ERR_ARGUMENT, "obstacle.normal"));
    o.normal[1] = NAN;
    CHECK(add_refused(&o, CLOTH_ERR_NONFINITE, "obstacle.normal[1] = NaN"));
    o.cookie = 0;
    CHECK(add_refused(&o, CLOTH_ERR_UNINIT, "cloth_obstacle_desc_default()"));
    CHECK(cloth_collide_add(NULL, &o, &id) == CLOTH_ERR_ARGUMENT && id.id == 0);
    host_forget(&H);
    CHECK(said(cloth_collide_add(W.c, NULL, &id), CLOTH_ERR_ARGUMENT, "desc is NULL"));
    CHECK(said(cloth_collide_move(W.c, W.ball, bad), CLOTH_ERR_NONFINITE, "x[1] = NaN"));
    CHECK(said(cloth_collide_move(W.c, W.ball, NULL), CLOTH_ERR_ARGUMENT, "NULL"));
    CHECK(said(cloth_collide_teleport(W.c, W.ball, inside), CLOTH_ERR_MESH, "intersect"));
    CHECK(said(cloth_collide_teleport(W.c, W.ball, bad), CLOTH_ERR_NONFINITE, "x[1] = NaN"));
    CHECK(said(cloth_collide_teleport(W.c, W.ball, NULL), CLOTH_ERR_ARGUMENT, "x is NULL"));
    CHECK(said(cloth_collide_step(W.c, 0.01, -1, NULL), CLOTH_ERR_ARGUMENT, "halvings = -1"));
    CHECK(said(cloth_collide_step(W.c, NAN, 2, NULL), CLOTH_ERR_NONFINITE, "NaN"));
    r.status = CLOTH_OK, r.outcome = CLOTH_STEP_CONVERGED;
    CHECK(said(cloth_collide_step(W.c, 0.01, 99, &r), CLOTH_ERR_ARGUMENT, "halvings = 99"));
    CHECK(r.status == CLOTH_ERR_ARGUMENT && r.outcome == CLOTH_STEP_NONE && r.vertex == -1);
    o = cloth_obstacle_desc_default();
    o.nv = 3, o.nf = 1, o.x = x, o.faces = faces;
    CHECK(cloth_collide_add(W.c, &o, &id) == CLOTH_OK && id.id != 0);
    stale = id;
    CHECK(cloth_collide_remove(W.c, id) == CLOTH_OK);
    host_forget(&H);
    CHECK(said(cloth_collide_remove(W.c, stale), CLOTH_ERR_HANDLE, "obstacle 3 is not there"));
    stale.id = 0;
    CHECK(said(cloth_collide_remove(W.c, stale), CLOTH_ERR_HANDLE, "cloth_collide_remove"));
    stale.id = 0x7fffffffu;
    CHECK(said(cloth_collide_move(W.c, stale, x), CLOTH_ERR_HANDLE, "cloth_collide_move"));
    CHECK(cloth_collide_remove(NULL, W.ball) == CLOTH_ERR_HANDLE);
    stale = id;
    o.self_penetrating = 1;                 /* an open mesh has no inside */
    CHECK(said(cloth_collide_add(W.c, &o, &id), CLOTH_ERR_MESH, "face 0 is open"));
    o.nv = 4, o.nf = 4, o.x = corner, o.faces = sides;
    CHECK(said(cloth_collide_add(W.c, &o, &id), CLOTH_ERR_MESH,
               "is turned against its neighbour"));
    o.nv = 3, o.nf = 1, o.x = x, o.faces = faces;
    o.self_penetrating = 0;
    CHECK(cloth_collide_add(W.c, &o, &id) == CLOTH_OK && id.id != stale.id);
    CHECK(cloth_collide_move(W.c, stale, x) == CLOTH_ERR_HANDLE);
    CHECK(cloth_collide_teleport(W.c, stale, x) == CLOTH_ERR_HANDLE);
    stale.id = 0x80000001u;
    CHECK(cloth_collide_move(W.c, stale, x) == CLOTH_ERR_HANDLE);
    CHECK(cloth_collide_move(NULL, id, x) == CLOTH_ERR_HANDLE);
    r.status = CLOTH_OK;
    CHECK(cloth_collide_step(NULL, 0.01, 0, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(r.status == CLOTH_ERR_ARGUMENT);
    host_forget(&H);
    CHECK(said(cloth_solve_static(W.sim, NULL), CLOTH_ERR_UNSUPPORTED, "cloth_solve_static"));
    CHECK(world_run(&W, 3, 1.0 / 60));
    world_close(&W);
    CHECK(H.live == 0);
}

/* What asks: NULL, sizes below 0, and lists of a world whose obstacles have just gone. */
static void queries(void) {
    cloth_hooks        hooks = host_hooks(&H);
    cloth_collide_contact        touch[8];
    cloth_collide_pair pair[8];
    double             gap = 7, f[3 * 64];
    int                count = 7, pairs[8];
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 20, 1.0 / 60));
#define ASK(call, what) CHECK(said(call, CLOTH_ERR_ARGUMENT, what))
    CHECK(cloth_collide_contacts(NULL, 8, touch, &count) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_forces(NULL, f) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_friction(NULL, f) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_gap(NULL, 1, &gap) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_intersections(NULL, 4, pairs, &count) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_failed(NULL, 8, pair, &count) == CLOTH_ERR_ARGUMENT);
    ASK(cloth_collide_contacts(W.c, -1, touch, &count), "cloth_collide_contacts: max = -1");
    ASK(cloth_collide_contacts(W.c, 8, NULL, &count), "cloth_collide_contacts: its output is NULL");
    ASK(cloth_collide_forces(W.c, NULL), "cloth_collide_forces: its output is NULL");
    ASK(cloth_collide_friction(W.c, NULL), "cloth_collide_friction");
    ASK(cloth_collide_gap(W.c, 0, &gap), "range = 0");
    ASK(cloth_collide_gap(W.c, -1, &gap), "range = -1");
    ASK(cloth_collide_gap(W.c, 0.01, NULL), "NULL");
    CHECK(said(cloth_collide_gap(W.c, NAN, &gap), CLOTH_ERR_NONFINITE, "range = NaN"));
    CHECK(said(cloth_collide_gap(W.c, INFINITY, &gap), CLOTH_ERR_NONFINITE, "range = inf"));
    ASK(cloth_collide_intersections(W.c, -1, pairs, &count), "cloth_collide_intersections: max");
    ASK(cloth_collide_intersections(W.c, 4, NULL, &count), "NULL");
    ASK(cloth_collide_failed(W.c, 8, NULL, &count), "cloth_collide_failed: its output");
    ASK(cloth_collide_failed(W.c, -8, pair, &count), "cloth_collide_failed: max = -8");
    CHECK(count == 7 && gap >= 7);
    CHECK(cloth_collide_last(NULL).contacts == 0);
    CHECK(cloth_collide_failed(W.c, 8, pair, &count) == CLOTH_OK && count == 0);
    CHECK(cloth_collide_contacts(W.c, 8, touch, &count) == CLOTH_OK && count > 0);
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    CHECK(cloth_collide_contacts(W.c, 8, touch, &count) == CLOTH_OK && count == 0);
    CHECK(cloth_step(W.sim, 1.0 / 60, NULL) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, W.ground) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1.0 / 60, NULL) == CLOTH_OK);
    world_close(&W);
}

/* Opens W and runs 8 steps; returns the hash that one more will lead to. */
static uint64_t open_before_ninth(const cloth_hooks *hooks, const cloth_collide_desc *contact) {
    uint64_t after;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, hooks, contact) == CLOTH_OK);
    CHECK(world_run(&W, 9, 1.0 / 60));
    after = cloth_sim_hash(W.sim);
    world_close(&W);
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, hooks, contact) == CLOTH_OK);
    CHECK(world_run(&W, 8, 1.0 / 60));
    return after;
}

/* A host wrote NaN into x: whatever looks at the cloth says so, and is as before when x is back. */
static void lost_state(void) {
    static const double away[3] = {5, 5, 5};
    cloth_hooks         hooks = host_hooks(&H);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id = {7};
    cloth_collide      *other = NULL;
    double              gap = 7, keep, *x;
    int                 count = 7;
    uint64_t            before, after;
    after = open_before_ninth(&hooks, NULL);
    before = cloth_sim_hash(W.sim);
    x = cloth_sim_state(W.sim)->x + 7;
    keep = *x, *x = NAN;
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = away, o.radius = 0.1;
#define LOST(call) CHECK(said(call, CLOTH_ERR_NONFINITE, "x[7] = NaN"))
    LOST(cloth_collide_gap(W.c, 0.01, &gap));
    LOST(cloth_collide_intersections(W.c, 0, NULL, &count));
    LOST(cloth_collide_add(W.c, &o, &id));
    LOST(cloth_collide_teleport(W.c, W.ball, away));
    LOST(cloth_collide_remove(W.c, W.ball));
    LOST(cloth_collide_step(W.c, 0.01, 3, NULL));
    LOST(cloth_collide_untangle(W.c, 0, NULL));
    CHECK(gap >= 7 && count == 7 && id.id == 0);
    *x = keep;
    CHECK(cloth_sim_hash(W.sim) == before);
    CHECK(world_run(&W, 1, 1.0 / 60) && cloth_sim_hash(W.sim) == after);
    cloth_collide_destroy(W.c);
    W.c = NULL, *x = NAN;
    host_forget(&H);
    LOST(cloth_collide_create(W.sim, NULL, &other));
    CHECK(!other);
    world_close(&W);
    CHECK(H.live == 0);
}

/* A ground that leaps by the largest number, or to where 1e12 of its thickness lie behind, is
 * refused; what is just allowed the zones cannot follow in four passes: the step's failure, not
 * the caller's. A leap of 5 m they follow, to above the ground; one of 2e9 m by chance alone, in 40
 * passes (1 of 27 of 100 m and more did), else it fails. */
static void absurd_zone(void) {
    static const double far[3] = {0, 1.7e308, 0}, lost[3] = {0, 2.01e9, 0};
    static const double leap[3] = {0, 1.99e9, 0}, ground[3] = {0, -0.2, 0};
    static const double leaps[4][3] = {{0, 1, 0}, {0, 2, 0}, {0, 5, 0}, {0, 1.99e9, 0}};
    cloth_collide_desc contact = cloth_collide_desc_default();
    cloth_hooks  hooks = host_hooks(&H);
    cloth_collide_contact touch[8];
    cloth_report r;
    uint64_t     before, after;
    int          count, live, k;
    contact.max_passes = 4;                 /* each takes hundreds of active sets */
    after = open_before_ninth(&hooks, &contact);
    CHECK(said(cloth_collide_move(W.c, W.ground, far), CLOTH_ERR_ARGUMENT, "x[1] = "));
    CHECK(said(cloth_collide_move(W.c, W.ground, lost), CLOTH_ERR_ARGUMENT, "at most 2e9"));
    CHECK(cloth_collide_move(W.c, W.ground, leap) == CLOTH_OK);
    before = cloth_sim_hash(W.sim);
    CHECK(said(cloth_step(W.sim, 1.0 / 60, &r), CLOTH_ERR_STEP, "could not be resolved"));
    CHECK(r.outcome == CLOTH_STEP_COLLISION_FAILED && r.failed_pairs > 0);
    CHECK(cloth_sim_hash(W.sim) == before);
    if (test_full()) {                      /* again: seconds for no memory more */
        live = H.live;
        CHECK(said(cloth_step(W.sim, 1.0 / 60, NULL), CLOTH_ERR_STEP, "could not be resolved"));
        CHECK(H.live == live);
    }
    CHECK(cloth_collide_contacts(W.c, 8, touch, &count) == CLOTH_OK && count == 0);
    CHECK(cloth_collide_move(W.c, W.ground, ground) == CLOTH_OK);
    CHECK(world_run(&W, 1, 1.0 / 60) && cloth_sim_hash(W.sim) == after);
    world_close(&W);
    CHECK(H.live == 0);
    for (k = 0; k < (test_full() ? 4 : 3); k++) {
        cloth_status status;
        (void)open_before_ninth(&hooks, NULL);
        CHECK(cloth_collide_move(W.c, W.ground, leaps[k]) == CLOTH_OK);
        before = cloth_sim_hash(W.sim);
        status = cloth_step(W.sim, 1.0 / 60, &r);
        if (status != CLOTH_OK) CHECK(k == 3 && cloth_sim_hash(W.sim) == before);
        else CHECK(r.smallest_gap > 0);
        CHECK(cloth_collide_intersections(W.c, 0, NULL, &count) == CLOTH_OK && count == 0);
        world_close(&W);
    }
}

/* Every allocation of create, add and the first steps fails in turn; nothing is lost. */
static void failing_allocator(void) {
    cloth_hooks hooks = host_hooks(&H);
    int         at, made, tried = 0, refused = 0;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 8, 1.0 / 60));
    made = H.calls;
    world_close(&W);
    for (at = 1; at <= made; at += test_quick() ? 7 : 1) {
        cloth_status status;
        int          i;
        tried++;
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
    CHECK(tried > 15 && refused > 0.8 * tried);
}

/* Each allocation of one call fails in turn: hash, pairs and the steps after it are as if it had
 * not been made. what: 0 add, 1 remove, 2 teleport, 3 gap, 4 intersections, 5 step, 6 shorter step
 */
static cloth_status one_call(int what) {
    static const double away[3] = {0.3, -0.1, 0.3}, x[12] = {0, -0.15, 0,    0.2, -0.15, 0,
                                                             0, -0.15, 0.2, 0.1, -0.18, 0.1};
    static const int    faces[12] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double              gap;
    int                 count;
    switch (what) {
    case 0:
        o.nv = 4, o.nf = 4, o.x = x, o.faces = faces, o.self_penetrating = 1;
        return cloth_collide_add(W.c, &o, NULL);
    case 1: return cloth_collide_remove(W.c, W.ball);
    case 2: return cloth_collide_teleport(W.c, W.ball, away);
    case 3: return cloth_collide_gap(W.c, 0.2, &gap);
    case 4: return cloth_collide_intersections(W.c, 0, NULL, &count);
    case 5: return cloth_step(W.sim, 1.0 / 60, NULL);
    default: return cloth_collide_step(W.c, 1.0 / 60, 3, NULL);
    }
}

static void failing_calls(void) {
    int what, most = 0;
    for (what = 0; what <= 6; what++) {
        cloth_hooks    hooks = host_hooks(&H);
        uint64_t       before, after;
        cloth_status   status = CLOTH_ERR_MEMORY;
        int            at;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        CHECK(world_run(&W, 11, 1.0 / 60));
        after = cloth_sim_hash(W.sim);
        world_close(&W);
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        CHECK(world_run(&W, 8, 1.0 / 60));
        before = cloth_sim_hash(W.sim);
        for (at = 1; status == CLOTH_ERR_MEMORY && at < 500; at++) {
            H.calls = 0, H.fail_at = at;
            status = one_call(what);
            H.fail_at = 0;
            if (status == CLOTH_OK) break;
            CHECK(status == CLOTH_ERR_MEMORY && cloth_sim_hash(W.sim) == before);
            if (at == 3 || what > 4) continue;
            CHECK(cloth_collide_contacts(W.c, 0, NULL, NULL) == CLOTH_OK);
        }
        CHECK(status == CLOTH_OK);
        most = at > most ? at : most;
        world_close(&W);
        CHECK(H.live == 0);
        if (what > 2) continue;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        CHECK(world_run(&W, 8, 1.0 / 60));
        for (at = 1; at < 40; at++) {       /* refused by memory, then gone on with */
            H.calls = 0, H.fail_at = at;
            status = one_call(what);
            H.fail_at = 0;
            if (status == CLOTH_OK) break;
            if (at == 6 || at == 17) break;
        }
        if (status) {
            CHECK(world_run(&W, 3, 1.0 / 60));
            CHECK(cloth_sim_hash(W.sim) == after);
        }
        world_close(&W);
        CHECK(H.live == 0);
    }
    CHECK(most > 13);
}

static void forget_record(void *user, const cloth_step_record *r) {
    *(int *)user += r->ncontact;
}

/* What a step needs to record its contacts is in its bytes, which are all that there is. */
static void recorded_bytes(void) {
    cloth_hooks    hooks = host_hooks(&H);
    cloth_recorder recorder;
    cloth_report   r;
    int            i, contacts = 0;
    memset(&recorder, 0, sizeof recorder);
    recorder.user = &contacts, recorder.step = forget_record;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(cloth_sim_set_recorder(W.sim, &recorder) == CLOTH_OK);
    for (i = 0; i < 20; i++) {
        CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_OK);
        CHECK(r.bytes.total == H.bytes);
    }
    CHECK(contacts > 0);
    world_close(&W);
    CHECK(H.live == 0);
}

/* At rest on the ground the touches carry the sheet. */
static void weight(void) {
    cloth_collide_contact touch[400];
    double     *f, sum = 0, sum_f = 0, gap;
    double      away[3] = {5, 5, 5};
    int         i, count;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_collide_teleport(W.c, W.ball, away) == CLOTH_OK);
    for (i = 0; i < 150; i++) CHECK(cloth_step(W.sim, 1.0 / 60, NULL) == CLOTH_OK);
    CHECK(cloth_collide_contacts(W.c, 400, touch, &count) == CLOTH_OK);
    for (i = 0; i < count && i < 400; i++) {
        sum += touch[i].force * touch[i].normal[1];
        CHECK(touch[i].pair.obstacle.id == W.ground.id && touch[i].n == 1);
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

/* Who moves an obstacle where a teleport is meant, 10 and 100 km in a step, is told what to look
 * for where the forces are beyond doubles; no status is asked for. */
static void leap(void) {
    cloth_hooks hooks = host_hooks(&H);
    double      way;
    for (way = 1e4; way < 1e6; way *= 10) {
        const double there[3] = {0.1 + 0.3 * way, way - 0.08, 0.1};
        cloth_status status;
        uint64_t     before;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        CHECK(world_run(&W, 14, 1.0 / 60));
        CHECK(cloth_collide_move(W.c, W.ball, there) == CLOTH_OK);
        before = cloth_sim_hash(W.sim);
        status = cloth_step(W.sim, 1.0 / 60, NULL);
        if (status) CHECK(cloth_sim_hash(W.sim) == before && H.errors == 1);
        if (status == CLOTH_ERR_NONFINITE) CHECK(strstr(H.text, "an obstacle leap"));
        world_close(&W);
        host_forget(&H);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(refusals);
    RUN(models);
    RUN(obstacles);
    RUN(queries);
    RUN(lost_state);
    RUN(absurd_zone);
    RUN(failing_allocator);
    RUN(failing_calls);
    RUN(recorded_bytes);
    RUN(weight);
    RUN(leap);
    return TEST_END();
}
