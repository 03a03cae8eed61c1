/* test_collide_state.c - contact from step to step: snapshots, workers, what a failed or a
 * cancelled step leaves behind, pinches, shorter steps, exemptions, groups.
 *   cc -std=c99 -O2 -ffp-contract=off -pthread -I.. test_collide_state.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include <limits.h>
#include "test.h"
#include "collide_world.h"
#include "shapes.h"
#include "threads.h"

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
        size_t       size, fresh;
        void        *buf;
        int          contacts = 0;
        CHECK(world_open(&W, kind[k], NULL, NULL) == CLOTH_OK);
        fresh = cloth_sim_save_size(W.sim);
        CHECK(world_run(&W, n, h));
        CHECK(cloth_collide_contacts(W.c, 0, NULL, &contacts) == CLOTH_OK);
        while (contacts == 0 && n < 240) {   /* there is contact to be kept */
            n++;
            CHECK(world_run(&W, 1, h));
            CHECK(cloth_collide_contacts(W.c, 0, NULL, &contacts) == CLOTH_OK);
        }
        CHECK(contacts > 0);
        size = cloth_sim_save_size(W.sim);
        if (k < 2) CHECK(size >= fresh + 40);           /* an anchor at least */
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

/* What a pair stands for: of layers of cloth, which meet from both sides, half of what the same
 * pair would have with an obstacle. */
static void layers_share_area(void) {
    clothi_contact q;
    const double  *area;
    int            k;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    area = W.c->area;
    for (k = 0; k < 2; k++) {
        memset(&q, 0, sizeof q);
        q.kind = CLOTHI_VF, q.slot = k ? 0 : -1;
        q.v[0] = 18, q.v[1] = 43, q.v[2] = 44, q.v[3] = 51;
        CHECK_REL(clothi_contact_area(W.c, &q), (k ? 1 : 0.5) *
                  fmin(area[18], (area[43] + area[44] + area[51]) / 6), 1e-15);
    }
    world_close(&W);
}

/* Two balls of one self-penetrating mesh pass through each other below the sheet and drift along;
 * the pose is a function of the time. Cloth in a pinch: test_pinch.c. */
static void body_run(cloth_obstacle body, const shape *s, double *pose, int n) {
    int i, k;
    for (k = 0; k < n; k++) {
        const double t = cloth_sim_state(W.sim)->t + 1.0 / 60;
        for (i = 0; i < s->nv; i++) {
            const double side = 2 * i < s->nv ? -1 : 1;
            pose[3 * i] = s->x[3 * i] + 0.3 * t - side * 0.08 * sin(6 * t);
            pose[3 * i + 1] = s->x[3 * i + 1];
            pose[3 * i + 2] = s->x[3 * i + 2];
        }
        CHECK(cloth_collide_move(W.c, body, pose) == CLOTH_OK);
        CHECK(cloth_step(W.sim, 1.0 / 60, NULL) == CLOTH_OK);
    }
}

/* On a body that penetrates itself a restored sim, and one that starts again, find the same. */
static void self_penetrating(void) {
    const double        a[3] = {0.02, -0.08, 0.1}, b[3] = {0.18, -0.08, 0.1};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      body;
    shape               s = {0, 0, NULL, NULL};
    double             *pose;
    void               *buf;
    uint64_t            middle, end;
    size_t              size;
    shape_sphere(&s, a, 0.06, 8);
    shape_sphere(&s, b, 0.06, 8);
    pose = (double *)malloc(3 * (size_t)s.nv * sizeof(double));
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    o.kind = CLOTH_OBSTACLE_MESH, o.self_penetrating = 1;
    o.nv = s.nv, o.x = s.x, o.nf = s.nf, o.faces = s.faces;
    CHECK(cloth_collide_add(W.c, &o, &body) == CLOTH_OK);
    body_run(body, &s, pose, 14);
    size = cloth_sim_save_size(W.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    middle = cloth_sim_hash(W.sim);
    body_run(body, &s, pose, 20);
    end = cloth_sim_hash(W.sim);
    CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_hash(W.sim) == middle);
    body_run(body, &s, pose, 20);
    CHECK(cloth_sim_hash(W.sim) == end);
    CHECK(cloth_sim_reset(W.sim) == CLOTH_OK);
    body_run(body, &s, pose, 14);
    CHECK(cloth_sim_hash(W.sim) == middle);
    free(buf);
    free(pose);
    world_close(&W);
    shape_free(&s);
}

static int stop_after;

static int give_up(void *user) {
    (void)user;
    return stop_after-- <= 0;
}

/* Wherever the hook asks to stop, the state is as before. */
static void cancel(void) {
    cloth_hooks hooks = host_hooks(&H);
    cloth_report r;
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
    stop_after = 0;
    before = cloth_sim_hash(W.sim);
    CHECK(cloth_collide_step(W.c, 1.0 / 60, 3, &r) == CLOTH_ERR_CANCELLED);
    CHECK(r.outcome == CLOTH_STEP_NONE && cloth_sim_hash(W.sim) == before);
    stop_after = 1 << 30;
    world_close(&W);
}

/* A free vertex before a pinned one that moves at 3 m/s leaves at 3 m/s, whatever h is. */
static void pushed_by_a_pin(void) {
    static double     v[192];
    cloth_contact_row row;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_LEAPFROG, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_sim_pin(W.sim, 5, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-4, NULL) == CLOTH_OK);
    memset(&row, 0, sizeof row);
    row.n = 2, row.kind = CLOTHI_EE, row.v[0] = 9, row.v[1] = 5, row.w[0] = 1, row.w[1] = -1;
    row.normal[1] = 1, row.multiplier = 1;
    CHECK(clothi_grow(W.c->hooks, (void **)&W.c->row, 1, &W.c->row_cap, sizeof row) == CLOTH_OK);
    W.c->row[0] = row, W.c->nrow = 1, W.c->h = 1e-2;
    memset(W.c->frozen, 0, 64);
    W.c->xb[16] = W.c->xa[16] + 3e-2;
    CHECK(clothi_zone_speeds(W.c, v) == CLOTH_OK);
    CHECK_NEAR(v[28], 3, 1e-12);
    W.c->nrow = 0;
    world_close(&W);
}

/* What becomes rigid goes as a whole, but for axes that are pinned. */
static void frozen_axes(void) {
    clothi_zone q;
    int         v = 27, k;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    memset(&q, 0, sizeof q);
    q.member = &v, q.size = 1;
    W.sim->pin[v] = CLOTH_AXIS_X;
    for (k = 0; k < 3; k++) {
        W.c->xa[3 * v + k] = W.c->xb[3 * v + k] = 1;
        W.c->x_ie[3 * v + k] = 2 + k;
    }
    clothi_zone_freeze(W.c, &q);
    for (k = 0; k < 3; k++) CHECK_NEAR(W.c->xb[3 * v + k], k ? 2 + k : 1, 0);
    world_close(&W);
}

static int no_time(void *user) {
    (void)user;
    return 2;
}

/* The contacts of the last step, whatever is asked, refused or moved since: a teleport (0.95 m on
 * 16 points, also one that was refused), a host's x and then the gap. */
static void record_stays(void) {
    static const double  inside[3] = {0.1, -0.03, 0.1}, away[3] = {0.1, -1, 0.1};
    cloth_collide_contact was[64], is[64];
    cloth_hooks          hooks = host_hooks(&H);
    cloth_obstacle_desc  o = cloth_obstacle_desc_default();
    double               gap;
    int                  k, i, n = 0, m = 0;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 20, 1.0 / 60));
    CHECK(cloth_collide_contacts(W.c, 64, was, &n) == CLOTH_OK && n > 4 && n <= 64);
    for (k = 0; k < 4; k++) {
        if (k == 0) CHECK(cloth_collide_teleport(W.c, W.ball, inside) == CLOTH_ERR_MESH);
        if (k == 1) CHECK(cloth_collide_teleport(W.c, W.ball, away) == CLOTH_OK);
        for (i = 0; i < W.mesh->nv && k == 2; i++) cloth_sim_state(W.sim)->x[3 * i + 1] += 0.5;
        if (k == 2) CHECK(cloth_collide_gap(W.c, 0.01, &gap) == CLOTH_OK);
        if (k == 3) CHECK(cloth_collide_intersections(W.c, 0, NULL, &i) == CLOTH_OK);
        CHECK(cloth_collide_contacts(W.c, 64, is, &m) == CLOTH_OK && m == n);
        CHECK(memcmp(is, was, (size_t)n * sizeof *is) == 0);
    }
    cloth_sim_state(W.sim)->x[0] = NAN;     /* refused, but not for what intersects */
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = away, o.radius = 0.1;
    W.c->nexempt = 1, memset(W.c->exempt, 0, sizeof *W.c->exempt);
    CHECK(cloth_collide_add(W.c, &o, NULL) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_collide_failed(W.c, 0, NULL, &m) == CLOTH_OK && m == 0);
    CHECK(cloth_collide_teleport(W.c, W.ball, away) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_collide_failed(W.c, 0, NULL, &m) == CLOTH_OK && m == 0);
    world_close(&W);
    CHECK(H.live == 0);
}

/* A host without time: one iteration a step, each end feasible, nothing lost or gained. */
static void finish_now(void) {
    cloth_hooks  hooks = host_hooks(&H);
    cloth_report r;
    double       gap = 0;
    int          i, pairs = -1;
    hooks.cancel.fn = no_time;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    for (i = 0; i < 40; i++) {
        CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_OK && r.newton <= 1);
        CHECK(cloth_collide_intersections(W.c, 0, NULL, &pairs) == CLOTH_OK && pairs == 0);
        CHECK(cloth_collide_gap(W.c, 0.1, &gap) == CLOTH_OK && gap > 0);
    }
    CHECK(r.contacts > 0);
    world_close(&W);
}

/* A snapshot goes to a sim that has not moved; one with other obstacles refuses it, as do all
 * allocations that fail, and is as before. */
static void transplant(void) {
    cloth_hooks    hooks = host_hooks(&H);
    world          other;
    uint64_t       middle, end, before;
    size_t         size;
    void          *buf;
    cloth_status   status = CLOTH_ERR_MEMORY;
    int            at;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 20, 1.0 / 60));
    size = cloth_sim_save_size(W.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    middle = cloth_sim_hash(W.sim);
    CHECK(world_run(&W, 6, 1.0 / 60));
    end = cloth_sim_hash(W.sim);
    world_close(&W);
    CHECK(world_open(&other, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    before = cloth_sim_hash(other.sim);
    for (at = 1; status == CLOTH_ERR_MEMORY && at < 20; at++) {
        H.calls = 0, H.fail_at = at;
        status = cloth_sim_restore(other.sim, buf, size);
        H.fail_at = 0;
        if (status) CHECK(status == CLOTH_ERR_MEMORY && cloth_sim_hash(other.sim) == before);
    }
    CHECK(status == CLOTH_OK && at > 2 && cloth_sim_hash(other.sim) == middle);
    CHECK(world_run(&other, 6, 1.0 / 60));
    CHECK(cloth_sim_hash(other.sim) == end);
    CHECK(cloth_collide_remove(other.c, other.ball) == CLOTH_OK);
    before = cloth_sim_hash(other.sim);
    host_forget(&H);
    CHECK(cloth_sim_restore(other.sim, buf, size) == CLOTH_ERR_FORMAT);
    CHECK(strstr(H.text, "other obstacles") && cloth_sim_hash(other.sim) == before);
    free(buf);
    world_close(&other);
    CHECK(H.live == 0);
}

/* One goes on alike in a sim whose obstacles came at another time of its life: thrown down, the
 * cloth crumples. */
static void other_times(void) {
    static const double below[3] = {0, -5, 0}, half[3] = {0.1, 0.1, 0.1};
    const double        h = world_h(CLOTH_INTEGRATOR_LEAPFROG);
    world               other;
    size_t              size;
    void               *buf;
    int                 i;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_LEAPFROG, NULL, NULL) == CLOTH_OK);
    CHECK(world_open(&other, CLOTH_INTEGRATOR_LEAPFROG, NULL, NULL) == CLOTH_OK);
    CHECK(world_box(&other, below, half, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 100, h));
    CHECK(world_box(&W, below, half, NULL) == CLOTH_OK);
    size = cloth_sim_save_size(W.sim);
    buf = malloc(size);
    for (i = 0; i < 3 * W.mesh->nv; i++)
        cloth_sim_state(W.sim)->v[i] = i % 3 == 1 ? -8 : 3 * sin(0.7 * i);
    cloth_sim_state_changed(W.sim);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(other.sim, buf, size) == CLOTH_OK);
    CHECK(world_run(&W, 10, h) && world_run(&other, 10, h));
    CHECK(cloth_sim_hash(other.sim) == cloth_sim_hash(W.sim));
    free(buf);
    world_close(&W);
    world_close(&other);
}

/* Obstacle `kind` of a world, a little another one where `other` is 1; 2: another band. */
static void shape_add(world *w, cloth_obstacle_kind kind, int other) {
    static double       phi[2][8] = {{1, 1, 1, 1, 1, 1, 1, 1}, {1, 1, 1, 1, 1, 1, 1, 0.5}};
    cloth_grid          g = {{2, 2, 2}, {0, 0, 0}, 1, 1, NULL};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    const double        mid[3] = {3, 0, 0}, half[3] = {other ? 0.1 : 0.2, 0.1, 0.1};
    double              x[24] = {0, 0, 0};
    g.phi = phi[other == 1], g.band = other == 2 ? 0.5 : 1;
    if (kind == CLOTH_OBSTACLE_BOX) cloth_obstacle_box(mid, half, NULL, x);
    else x[0] = kind == CLOTH_OBSTACLE_SPHERE && other ? 3.15 : 3;
    o.kind = kind, o.x = x, o.grid = &g, o.radius = kind == CLOTH_OBSTACLE_GRID ? 0 : 0.05;
    CHECK(cloth_collide_add(w->c, &o, NULL) == CLOTH_OK);
}

/* A snapshot knows the shape that an obstacle was added with, whose poses go on from there (it was
 * taken, the hashes were the same, the next poses others); not which slots were in use once. */
static void other_shapes(void) {
    static const cloth_obstacle_kind kind[4] = {CLOTH_OBSTACLE_SPHERE, CLOTH_OBSTACLE_BOX,
                                                CLOTH_OBSTACLE_GRID, CLOTH_OBSTACLE_GRID};
    static const double away[3] = {5, 5, 5};
    cloth_hooks         hooks = host_hooks(&H);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    world               other;
    int                 k;
    for (k = 0; k < 4; k++) {
        size_t size;
        void  *buf;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        CHECK(world_open(&other, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        shape_add(&W, kind[k], 0);
        shape_add(&other, kind[k], k < 3 ? 1 : 2);
        size = cloth_sim_save_size(W.sim);
        buf = malloc(size);
        CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
        CHECK(cloth_sim_restore(other.sim, buf, size) == CLOTH_ERR_FORMAT);
        o.kind = CLOTH_OBSTACLE_SPHERE, o.x = away, o.radius = 0.1;
        CHECK(cloth_collide_add(W.c, &o, &id) == CLOTH_OK);
        CHECK(cloth_collide_remove(W.c, id) == CLOTH_OK);
        CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_OK);
        free(buf);
        world_close(&W);
        world_close(&other);
    }
}

/* Areas are those of the obstacles as they were added, whatever pose another one finds them in:
 * a restored sim has not seen the poses between. */
static void areas_as_added(void) {
    static const double center[3] = {0.1, -0.5, 0.1}, half[3] = {0.05, 0.05, 0.05};
    static const double wide[3] = {0.1, 0.1, 0.1}, far[3] = {3, 3, 3};
    cloth_obstacle      box;
    double              x[24], area;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(world_box(&W, center, half, &box) == CLOTH_OK);
    area = W.c->area[W.c->obstacle[2].v0];
    cloth_obstacle_box(center, wide, NULL, x);
    CHECK(cloth_collide_move(W.c, box, x) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-3, NULL) == CLOTH_OK);
    CHECK(world_box(&W, far, half, NULL) == CLOTH_OK);
    CHECK_NEAR(W.c->area[W.c->obstacle[2].v0], area, 0);
    world_close(&W);
}

/* What goes with an obstacle are its anchors, not those of cloth on a part of the same number. */
static void removed_without_folds(void) {
    int i, other = 0;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 20, 1.0 / 60));
    CHECK(W.c->nanchor > 1);
    W.c->anchor[W.c->nanchor - 1].key.cloth = 1;
    W.c->anchor[W.c->nanchor - 1].key.b = 0;        /* the first part's one side; the ball's slot */
    for (i = 0; i < W.c->nanchor; i++)
        other += W.c->anchor[i].key.cloth || W.c->anchor[i].key.b != 0;
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    CHECK(W.c->nanchor == other);
    world_close(&W);
}

/* Saves what *field says when it holds `value`, and restores: refused, with `what` in a sentence,
 * and the sim as before. */
static void forge(void *field, const void *value, size_t bytes, const char *what) {
    const size_t   size = cloth_sim_save_size(W.sim);
    const uint64_t before = cloth_sim_hash(W.sim);
    unsigned char  kept[64];
    void          *buf = malloc(size);
    CHECK(buf && bytes <= sizeof kept);
    memcpy(kept, field, bytes);
    memcpy(field, value, bytes);
    CHECK(cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    memcpy(field, kept, bytes);
    host_forget(&H);
    CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_ERR_FORMAT);
    CHECK(H.errors == 1 && strstr(H.text, what) != NULL);
    CHECK(cloth_sim_hash(W.sim) == before);
    CHECK(cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_OK);
    free(buf);
}

/* Snapshots with the right checksum that name what is not there. */
static void forged(void) {
    const int          bad[] = {-1, 1 << 20, INT_MAX, INT_MIN};
    const double       number[] = {NAN, INFINITY};
    cloth_collide_desc d = cloth_collide_desc_default();
    cloth_hooks        hooks = host_hooks(&H);
    double             through[3] = {0.1, 0, 0.1};
    const double       less = -5;
    clothi_anchor     *a;
    clothi_pair_id    *p, swap[2];
    clothi_obstacle   *o;
    int                i;
    d.initial = CLOTH_INITIAL_EXEMPT;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, &d) == CLOTH_OK);
    CHECK(world_run(&W, 20, 1.0 / 60));
    a = W.c->anchor + W.c->nanchor / 2;
    CHECK(W.c->nanchor > 1);
    for (i = 0; i < 4; i++) {
        forge(&a->key.feature, bad + i, sizeof *bad, "anchor");
        forge(&a->key.cloth, bad + i, sizeof *bad, "anchor");
        forge(&a->key.a, bad + i, sizeof *bad, "anchor");
        forge(&a->key.b, bad + i, sizeof *bad, "anchor");
    }
    for (i = 0; i < 2; i++) {
        forge(&a->force, number + i, sizeof *number, "anchor");
        forge(&a->gap, number + i, sizeof *number, "anchor");
        forge(a->slip + 2, number + i, sizeof *number, "anchor");
        o = W.c->obstacle + i;
        forge(o->x + 1, number + i, sizeof *number, "a pose");
        forge(o->x + 5, number + i, sizeof *number, "a pose");
        forge(o->turn[1] + 8, number + i, sizeof *number, "a pose");
        forge(o->surface + 5, number + i, sizeof *number, "a surface");
        forge(&o->friction, number + i, sizeof *number, "a friction");
        forge(&o->friction, &less, sizeof less, "a friction");
    }
    forge(a, a - 1, sizeof *a, "anchor");
    CHECK(cloth_collide_teleport(W.c, W.ball, through) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-3, NULL) == CLOTH_OK && W.c->nexempt > 1);
    p = W.c->exempt + W.c->nexempt / 2;
    for (i = 0; i < 4; i++) {
        if (bad[i] != CLOTHI_FF) forge(&p->kind, bad + i, sizeof *bad, "exempts a pair");
        forge(&p->a, bad + i, sizeof *bad, "exempts a pair");
        forge(&p->b, bad + i, sizeof *bad, "exempts a pair");
    }
    swap[0] = p[0], swap[1] = p[-1];
    forge(p - 1, swap, sizeof swap, "exempts a pair");
    world_close(&W);
    CHECK(H.live == 0);
}

/* The sim, its model and its contact go in any order in which the model outlives the sim. */
static void destruction(void) {
    cloth_hooks hooks = host_hooks(&H);
    int         k;
    for (k = 0; k < 3; k++) {
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
        CHECK(world_run(&W, 4, 1.0 / 60));
        if (k == 0) cloth_collide_destroy(W.c), W.c = NULL;
        cloth_sim_destroy(W.sim);
        if (k == 2) cloth_model_destroy(W.model), W.model = NULL;
        W.sim = NULL;
        world_close(&W);                    /* contact, then what is left */
        CHECK(H.live == 0);
    }
}

/* A contact that was taken away: neither sim nor its next contact know it, whoever goes first. */
static void taken_away(void) {
    cloth_hooks    hooks = host_hooks(&H);
    cloth_collide *first, *more;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 4, 1.0 / 60));
    first = W.c;
    CHECK(cloth_sim_set_contact(W.sim, NULL) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, NULL, &W.c) == CLOTH_OK);
    cloth_collide_destroy(first);
    CHECK(cloth_collide_create(W.sim, NULL, &more) == CLOTH_ERR_ARGUMENT && !more);
    CHECK(cloth_sim_set_contact(W.sim, NULL) == CLOTH_OK);
    cloth_sim_destroy(W.sim), W.sim = NULL;
    cloth_model_destroy(W.model), W.model = NULL;
    world_close(&W);
    CHECK(H.live == 0);
}

/* --- 1, 2 and 3 workers --- */

static void workers(void) {
    const cloth_integrator kind[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                      CLOTH_INTEGRATOR_LEAPFROG};
    int k, n;
    for (k = 0; k < 3; k++) {
        const double h = world_h(kind[k]);
        const int    steps = (kind[k] == CLOTH_INTEGRATOR_LEAPFROG ? 120 : 20) / (k + 1);
        uint64_t     alone = 0;
        for (n = 0; n <= 4; n++) {
            cloth_hooks  hooks;
            host_reverse three;
            int          many = n < 1 ? 1 : n;
            memset(&hooks, 0, sizeof hooks);
            if (n) hooks.parallel.run = threads_run;
            hooks.parallel.user = &many;
            hooks.parallel.max_workers = many;
            if (n == 4) host_turn_round(&hooks, &three, 3);
            CHECK(world_open(&W, kind[k], &hooks, NULL) == CLOTH_OK);
            CHECK(world_run(&W, steps, h));
            if (n == 0) alone = cloth_sim_hash(W.sim);
            CHECK(cloth_sim_hash(W.sim) == alone);
            world_close(&W);
        }
    }
}

/* Forces of LEAPFROG's rows are what momentum says, M ((v - v^n)/h + g) in all, also where a gap
 * is made good that takes a vertex farther than it was fast. */
static void row_forces(void) {
    static const double          near[3] = {0, -1e-3, 0};
    static cloth_collide_contact q[64];
    static double                f[3 * 64];
    const double                 h = 1.0 / 8000;
    int                          i, k, count = 0, hits = 0;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_LEAPFROG, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    CHECK(cloth_collide_teleport(W.c, W.ground, near) == CLOTH_OK);
    for (k = 0; k < 400; k++) {                         /* of one substep                      */
        double pushed = 0, sum = 0, off = 0, m;
        for (i = 0; i < W.mesh->nv; i++)
            pushed -= W.sim->params.mass[i] * cloth_sim_state(W.sim)->v[3 * i + 1];
        CHECK(cloth_step(W.sim, h, NULL) == CLOTH_OK);
        CHECK(cloth_collide_contacts(W.c, 64, q, &count) == CLOTH_OK && count <= 64);
        CHECK(cloth_collide_forces(W.c, f) == CLOTH_OK);
        for (i = 0; i < W.mesh->nv; i++) {
            m = W.sim->params.mass[i];
            pushed += m * (cloth_sim_state(W.sim)->v[3 * i + 1] - h * W.sim->gravity[1]);
            sum += f[3 * i + 1];
        }
        for (i = 0; i < count && i < 64; i++) {
            CHECK(q[i].n == 1 && (q[i].flags & CLOTH_CONTACT_ROW) != 0);
            off -= q[i].force * q[i].normal[1];
        }
        CHECK_NEAR(sum + off, 0, 1e-9);
        CHECK_NEAR(sum * h, pushed, 1e-12);
        hits += count > 0;
    }
    CHECK(hits > 1);
    world_close(&W);
}

/* A step of LEAPFROG that is taken again, as the cloth stretched beyond what its substeps bear, is
 * to contact as one that had as many at once. */
static void taken_again(void) {
    static const double  near[3] = {0.1, -0.0625, 0.1};
    cloth_collide_report q[2];
    cloth_report         r[2];
    uint64_t             hash[2];
    int                  k, i, m = 0;
    for (k = 0; k < 2; k++) {
        double *v;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_LEAPFROG, NULL, NULL) == CLOTH_OK);
        CHECK(cloth_collide_teleport(W.c, W.ball, near) == CLOTH_OK);
        W.model->desc.substeps = m;
        for (i = 0, v = cloth_sim_state(W.sim)->v; i < W.mesh->nv; i++, v += 3)
            v[0] = 140 * W.mesh->x[3 * i], v[1] = -1;
        cloth_sim_state_changed(W.sim);
        CHECK(cloth_step(W.sim, 1.0 / 60, r + k) == CLOTH_OK);
        q[k] = cloth_collide_last(W.c);
        m = (int)(1.0 / 60 / W.sim->h_prev + 0.5);
        hash[k] = cloth_sim_hash(W.sim);
        world_close(&W);
    }
    printf("  %d substeps, then %d at once; impacts %d and %d\n", r[0].substeps, r[1].substeps,
           q[0].impacts, q[1].impacts);
    CHECK(r[0].substeps > r[1].substeps && hash[0] == hash[1]);     /* and those given up */
    CHECK(q[1].impacts > 0 && q[0].impacts == q[1].impacts);
    CHECK(q[0].candidates == q[1].candidates && q[0].zones == q[1].zones);
}

/* --- zones on workers --- */

typedef struct crew {                       /* workers that may not call other hooks           */
    int             many, inside, asked, ranges;
    host_reverse    backwards;              /* many 0: one thread, ranges from the last one    */
} crew;

static void crew_run(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    crew *w = (crew *)user;
    w->inside = 1;
    if (w->many) threads_run(&w->many, count, grain, fn, ctx);
    else host_backwards(&w->backwards, count, grain, fn, ctx);
    w->inside = 0;
    w->ranges++;
}

static int crew_cancel(void *user) {
    ((crew *)user)->asked += ((crew *)user)->inside;
    return 0;
}

static void *crew_alloc(size_t size, void *user) {
    ((crew *)user)->asked += ((crew *)user)->inside;
    return malloc(size);
}

static void crew_free(void *p, size_t size, void *user) {
    (void)size;
    ((crew *)user)->asked += ((crew *)user)->inside;
    free(p);
}

/* Eight pairs of small sheets and one of larger ones are thrown at a box: zones of some rows, and
 * of more than the exact QP takes. Returns the hash; *zones, *rows: the most of a step. */
static uint64_t thrown_pairs(cloth_integrator kind, const cloth_hooks *hooks, int *zones,
                             int *rows) {
    static const double center[3] = {0.6, -0.06, 0.2}, half[3] = {1, 0.05, 0.6};
    static const double up[3] = {0.6, -0.06 + 1e-3, 0.2};
    double              corner[24];
    cloth_desc          d = cloth_desc_default();
    cloth_mesh         *sheet[18];
    cloth_obstacle      box;
    uint64_t            hash;
    int                 k, i, n;
    memset(&W, 0, sizeof W);
    for (k = 0; k < 18; k++) {
        const double size = k < 16 ? 0.1 : 0.3;
        n = k < 16 ? 4 : 9;
        if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, size, size, sheet + k)) exit(2);
        for (i = 0; i < n * n; i++) {
            double *x = sheet[k]->x + 3 * i;
            x[0] += k < 16 ? 0.15 * (k / 2) + 0.013 * (k % 2) : 0.3 + 0.007 * (k % 2);
            x[1] += 0.004 + 0.004 * (k % 2) + 0.001 * sin(40 * x[0] + 30 * x[2] + k);
            x[2] += k < 16 ? 0 : 0.2;
        }
    }
    if (cloth_mesh_merge(NULL, sheet, 18, &W.mesh)) exit(2);
    for (k = 0; k < 18; k++) cloth_mesh_destroy(NULL, sheet[k]);
    d.hooks = *hooks, d.contact = CLOTH_CONTACT_SELF, d.integrator = kind;
    d.nv = W.mesh->nv, d.x_rest = W.mesh->x, d.nf = W.mesh->nf, d.faces = W.mesh->faces;
    CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
    CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, NULL, &W.c) == CLOTH_OK);
    CHECK(world_box(&W, center, half, &box) == CLOTH_OK);
    for (i = 0; i < W.mesh->nv; i++) cloth_sim_state(W.sim)->v[3 * i + 1] = -4;
    cloth_obstacle_box(up, half, NULL, corner);     /* at rest: no zones */
    CHECK(cloth_collide_move(W.c, box, corner) == CLOTH_OK);
    for (*zones = *rows = k = 0; k < (kind == CLOTH_INTEGRATOR_LEAPFROG ? 4 : 1); k++) {
        cloth_collide_report r;
        CHECK(cloth_step(W.sim, world_h(kind), NULL) == CLOTH_OK);
        r = cloth_collide_last(W.c);
        *zones = r.zones > *zones ? r.zones : *zones;
        *rows = r.largest_zone > *rows ? r.largest_zone : *rows;
    }
    hash = cloth_sim_hash(W.sim);
    world_close(&W);
    return hash;
}

/* The same bits for no workers, one to four, and ranges from the last one; no hook is called from
 * a range. */
static void zones_on_workers(void) {
    int kind, n, zones, rows;
    for (kind = 0; kind < 2; kind++) {
        const cloth_integrator how = kind ? CLOTH_INTEGRATOR_LEAPFROG : CLOTH_INTEGRATOR_EULER;
        cloth_hooks            hooks;
        uint64_t               alone;
        memset(&hooks, 0, sizeof hooks);
        alone = thrown_pairs(how, &hooks, &zones, &rows);
        printf("    %i zones, %i rows in the largest\n", zones, rows);
        CHECK(zones >= 9 && rows > CLOTHI_LARGE_ZONE);
        for (n = 0; n <= 4; n++) {
            crew w;
            memset(&w, 0, sizeof w);
            w.many = n;
            host_turn_round(&hooks, &w.backwards, 3);
            hooks.parallel.run = crew_run, hooks.parallel.user = &w;
            hooks.parallel.max_workers = n ? n : 3;
            hooks.cancel.fn = crew_cancel, hooks.cancel.user = &w;
            hooks.allocator.alloc = crew_alloc, hooks.allocator.free = crew_free;
            hooks.allocator.user = &w;
            CHECK(thrown_pairs(how, &hooks, &zones, &rows) == alone);
            CHECK(w.ranges > 0 && w.asked == 0);
        }
    }
}

/* Zones of `each` rows of which `push` push, between vertices of one of 8 groups of 8: how often
 * workers ask the allocator for what their programs on speeds take. */
static int asked_by_workers(int each, int push) {
    static double v[192];
    cloth_hooks   hooks;
    crew          w;
    int           i, k;
    memset(&w, 0, sizeof w);
    memset(&hooks, 0, sizeof hooks);
    host_turn_round(&hooks, &w.backwards, 3);
    hooks.parallel.run = crew_run, hooks.parallel.user = &w;
    hooks.parallel.max_workers = 3;
    hooks.allocator.alloc = crew_alloc, hooks.allocator.free = crew_free;
    hooks.allocator.user = &w;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_LEAPFROG, &hooks, NULL) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-4, NULL) == CLOTH_OK && W.mesh->nv == 64);
    CHECK(clothi_grow(W.c->hooks, (void **)&W.c->row, 8 * each, &W.c->row_cap,
                      sizeof *W.c->row) == CLOTH_OK);
    for (i = 0, W.c->nrow = 8 * each; i < 8 * each; i++) {
        cloth_contact_row *row = W.c->row + i;
        memset(row, 0, sizeof *row);
        row->n = 2, row->kind = CLOTHI_EE, row->normal[i % 3] = 1, row->w[0] = 1, row->w[1] = -1;
        for (k = 0; k < 2; k++) row->v[k] = 8 * (i % 8) + (i / 8 + k * (1 + i / 64 % 7)) % 8;
        row->multiplier = i / 8 < push;
    }
    w.asked = w.ranges = 0;
    CHECK(clothi_zone_speeds(W.c, v) == CLOTH_OK && w.ranges > 0);
    W.c->nrow = 0;
    world_close(&W);
    return w.asked;
}

/* A zone is large by its rows, of which few may push; a small one has all that it takes. */
static void zones_of_any_size(void) {
    CHECK(asked_by_workers(250, 100) == 0);
    CHECK(asked_by_workers(60, 60) == 0);
    CHECK(asked_by_workers(1, 1) == 0);
    CHECK(asked_by_workers(2, 2) == 0);
}

/* Where the way to the guess is an impact BDF2 begins anew, and the report says so. */
static void impact_restarts(void) {
    cloth_report r;
    int          i, seen = 0, had;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_BDF2, NULL, NULL) == CLOTH_OK);
    for (i = 0; i < 60; i++) {
        had = W.sim->history;
        CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_OK);
        if (!had || cloth_collide_last(W.c).zones == 0) continue;
        seen++;
        CHECK(r.restarts == 1);
    }
    CHECK(seen > 0);
    world_close(&W);
}

/* Two plates close to less than the cloth needs, and open again. */
static void pinch(void) {
    cloth_hooks         hooks = host_hooks(&H);
    cloth_desc          d = cloth_desc_default();
    cloth_collide_pair  pair[8];
    cloth_obstacle      low, high;
    cloth_report        r;
    double              x[24], center[3] = {0.1, -0.052, 0.1}, half[3] = {0.2, 0.05, 0.2};
    int                 i, count = 0, failed = 0, frame;
    memset(&W, 0, sizeof W);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 8, 8, 0.2, 0.2, &W.mesh)) exit(2);
    d.hooks = hooks;
    d.nv = W.mesh->nv, d.x_rest = W.mesh->x, d.nf = W.mesh->nf, d.faces = W.mesh->faces;
    d.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
    CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, NULL, &W.c) == CLOTH_OK);
    CHECK(world_box(&W, center, half, &low) == CLOTH_OK);
    center[1] = 0.06;
    CHECK(world_box(&W, center, half, &high) == CLOTH_OK);
    for (frame = 0; frame < 40; frame++) {  /* the upper one: 0.01 above, down to -0.0015, back */
        const double   gap = frame < 20 ? 0.01 - 0.000575 * frame
                                             : -0.0015 + 0.000575 * (frame - 20);
        uint64_t       before;
        center[1] = 0.05 + gap;
        cloth_obstacle_box(center, half, NULL, x);
        CHECK(cloth_collide_move(W.c, high, x) == CLOTH_OK);
        before = cloth_sim_hash(W.sim);     /* the target is state */
        i = cloth_step(W.sim, 1.0 / 60, &r) != CLOTH_OK;
        if (i) {
            CHECK(r.status == CLOTH_ERR_STEP && r.outcome == CLOTH_STEP_COLLISION_FAILED);
            CHECK(r.failed_pairs > 0);
            CHECK(cloth_collide_failed(W.c, 8, pair, &count) == CLOTH_OK && count > 0);
            CHECK(pair[0].obstacle.id == low.id || pair[0].obstacle.id == high.id);
            CHECK(cloth_sim_hash(W.sim) == before);
        }
        failed += i;
    }
    CHECK(failed > 0 && failed < 20 && r.status == CLOTH_OK);
    world_close(&W);
    CHECK(H.live == 0);
}

/* What drags a held vertex: gradient and Hessian are those of its energy, by differences; near its
 * end a spring, far from it a force that is never more than t/2 of the membrane's stiffness, 27 t
 * on what goes out, and of that what edges beside it bear. */
static void pull(void) {
    static const double spring = 10, way[3] = {1e-7, 1e-3, 1};
    static const double half[3] = {0.2, 0.05, 0.2}, center[3] = {0.1, -0.06, 0.1};
    static const double out[3] = {0.6, -0.48, 0.64};        /* of length 1                     */
    cloth_desc     d = cloth_desc_default();
    cloth_obstacle box;
    cloth_hold     h;
    double         stiff, most, x[3], g[3], H9[9], up[3], down[3], none[9];
    int            w, i, k;
    memset(&W, 0, sizeof W);
    memset(&h, 0, sizeof h);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 4, 4, 0.2, 0.2, &W.mesh)) exit(2);
    cloth_desc_set_mesh(&d, W.mesh);
    d.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
    CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, NULL, &W.c) == CLOTH_OK);
    CHECK(world_box(&W, center, half, &box) == CLOTH_OK);
    stiff = clothi_membrane_stiffness(cloth_sim_params(W.sim)->material);
    h.vertex = 5;
    for (w = 0; w < 6; w++) {
        const double dist = way[w / 2], e = 1e-4 * dist;
        double       size = 0;
        W.c->look[h.vertex] = w % 2 ? CLOTHI_OUT : CLOTHI_HELD;
        most = (w % 2 ? 27 : 0.5) * W.c->desc.thickness * stiff;
        for (i = 0; i < 3; i++) W.c->hold_to[3 * h.vertex + i] = 0;
        for (i = 0; i < 3; i++) x[i] = dist * out[i];
        (void)clothi_hold_pull(W.c, &h, x, g, H9);
        for (i = 0; i < 3; i++) {
            const double at = x[i];
            double       more, less;
            x[i] = at + e, more = clothi_hold_pull(W.c, &h, x, up, none);
            x[i] = at - e, less = clothi_hold_pull(W.c, &h, x, down, none);
            x[i] = at;
            CHECK_NEAR(g[i], (more - less) / (2 * e), 1e-4 * most * dist / (dist + 1e-3));
            for (k = 0; k < 3; k++)
                CHECK_NEAR(H9[3 * k + i], (up[k] - down[k]) / (2 * e), 1e-6 * spring * stiff);
            size += g[i] * out[i];
        }
        CHECK(size > 0 && size < most);
        if (w < 2) CHECK_REL(size, spring * stiff * dist, 1e-4);
        if (w > 3) CHECK_REL(size, most, 1e-3);
    }
    for (i = 0; i < 6 * W.mesh->nf; i++) W.sim->params.X[i] *= 2;   /* not what x_rest has     */
    for (w = 0; w < 4; w++) {               /* far away it is the most, of which an edge leaves */
        static const double longer[4] = {2.9, 3.6, 4.8, 6}, left[4] = {1, 0.7, 0.1, 0.05};
        const double       *rest = W.model->x_rest;
        double              size = 0;
        memcpy(W.c->xa, rest, 3 * (size_t)W.mesh->nv * sizeof(double));
        for (i = 0; i < 3; i++)
            W.c->xa[3 * 6 + i] = rest[3 * 5 + i] + longer[w] * (rest[3 * 6 + i] - rest[3 * 5 + i]);
        for (i = 0; i < 3; i++) x[i] = 100 * out[i];
        (void)clothi_hold_pull(W.c, &h, x, g, H9);
        for (i = 0; i < 3; i++) size += g[i] * out[i];
        CHECK_REL(size, 27 * left[w] * W.c->desc.thickness * stiff, 1e-3);
    }
    world_close(&W);
}

/* An obstacle that is not there, as a forged snapshot may say, carries nothing and gets nothing
 * backwards; one that is does. */
static void carried_by_nothing(void) {
    static const double center[3] = {0.1, -0.5, 0.1}, half[3] = {0.05, 0.05, 0.05};
    static const double third[3] = {0.3, 0.3, 0.4};
    static const int    on[4] = {3, 4, 100000, -1};
    double              a[3 * 64], sum;
    cloth_attachment    id;
    cloth_obstacle      box;
    int                 i, k;
    for (i = 0; i < 3 * 64; i++) a[i] = 1;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(world_box(&W, center, half, &box) == CLOTH_OK);
    CHECK(W.model->desc.max_attachments > 0 && W.model->desc.max_attachments <= 64);
    CHECK(cloth_collide_attach(W.c, box, 1, third, 5, third, 1, &id) == CLOTH_OK);
    for (k = 0; k < 5; k++) {
        W.sim->attach[0].on = on[k % 4];
        W.sim->attach[0].other = k < 4 ? 1 : 12;            /* a box has faces 0 .. 11 */
        CHECK(clothi_adjoint_open(W.c) == CLOTH_OK);
        clothi_back_carried(W.c, a);
        for (sum = 0, i = 0; i < 3 * (W.c->nw - W.c->nv); i++) sum += W.c->adjoint->pose[0][i];
        CHECK_NEAR(sum, k ? 0 : 3, 1e-14);
        clothi_adjoint_free(W.c);
    }
    world_close(&W);
}

/* What one body holds passes that body, not another, though that has a pinch as well. */
static void held_by_one(void) {
    static const double center[3] = {0.1, -0.5, 0.1}, half[3] = {0.05, 0.05, 0.05};
    static const double far[3] = {3, 3, 3};
    cloth_hold         *was, h;
    clothi_pair_id      p = {CLOTHI_VF, 20, 0};
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(world_box(&W, center, half, NULL) == CLOTH_OK);
    CHECK(world_box(&W, far, half, NULL) == CLOTH_OK);
    memset(&h, 0, sizeof h);
    was = W.c->holding;
    h.vertex = 20, h.slot = 2, W.c->holding = &h, W.c->nholding = 1, W.c->held_of[20] = 0;
    p.b = W.c->obstacle[3].f0, W.c->pinched[p.b] = 1;
    CHECK(!clothi_pair_held(W.c, &p));
    h.slot = 3;
    CHECK(clothi_pair_held(W.c, &p));
    W.c->holding = was, W.c->nholding = 0;
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

/* The plates of the pinch in one leap: the whole step fails, half of it has room. */
static void shorter(void) {
    cloth_hooks         hooks = host_hooks(&H);
    double              x[24], there[24], center[3] = {0.1, -0.055, 0.1};
    double              half[3] = {0.3, 0.05, 0.3}, gap = 0;
    cloth_obstacle      high;
    cloth_report        r;
    uint64_t            before;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    CHECK(world_box(&W, center, half, NULL) == CLOTH_OK);
    center[1] = 0.06;
    CHECK(world_box(&W, center, half, &high) == CLOTH_OK);
    cloth_obstacle_box(center, half, NULL, x);
    center[1] = 0.035;                      /* 0.01 below the upper face of the lower one */
    cloth_obstacle_box(center, half, NULL, there);
    CHECK(cloth_collide_move(W.c, high, there) == CLOTH_OK);
    before = cloth_sim_hash(W.sim);
    CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_ERR_STEP && r.failed_pairs > 0);
    CHECK(cloth_collide_step(W.c, 1.0 / 60, 0, &r) == CLOTH_ERR_STEP);
    CHECK(cloth_sim_hash(W.sim) == before && !(cloth_collide_last(W.c).fraction > 0));
    CHECK(cloth_collide_step(W.c, 1.0 / 60, 6, &r) == CLOTH_OK && r.status == CLOTH_OK);
    CHECK_NEAR(cloth_collide_last(W.c).fraction, 0.5, 0);
    CHECK_REL(cloth_sim_state(W.sim)->t, 0.5 / 60, 1e-14);
    CHECK(cloth_collide_gap(W.c, 0.1, &gap) == CLOTH_OK && gap > 0);
    before = cloth_sim_hash(W.sim);         /* the target is still where it was asked for */
    CHECK(cloth_collide_move(W.c, high, there) == CLOTH_OK);
    CHECK(cloth_sim_hash(W.sim) == before);
    CHECK(cloth_collide_step(W.c, 1.0 / 60, 1, &r) == CLOTH_ERR_STEP && r.failed_pairs > 0);
    CHECK(cloth_sim_hash(W.sim) == before && !(cloth_collide_last(W.c).fraction > 0));
    CHECK(cloth_collide_move(W.c, high, x) == CLOTH_OK);    /* back to where it began */
    CHECK(cloth_collide_step(W.c, 1.0 / 60, 1, &r) == CLOTH_OK);
    CHECK_NEAR(cloth_collide_last(W.c).fraction, 1, 0);
    CHECK(cloth_collide_step(W.c, NAN, 1, &r) == CLOTH_ERR_NONFINITE);
    CHECK(!(cloth_collide_last(W.c).fraction > 0));
    world_close(&W);
    CHECK(H.live == 0);
}

/* Two sheets of 5 x 5, one 0.02 m above the other and falling on it at 3 m/s; the lower one is
 * pinned. Returns the pairs of faces that intersect on the way, -1 after a failure. */
static int two_sheets(cloth_contact_rung rung, const cloth_collide_part *part, double *end) {
    cloth_desc         d = cloth_desc_default();
    cloth_collide_desc k = cloth_collide_desc_default();
    double             x[150];
    int                faces[192], of[64], i, n = 0, most = 0, nv, nf;
    cloth_pin          pins[25];
    memset(&W, 0, sizeof W);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 5, 5, 0.2, 0.2, &W.mesh)) exit(2);
    nv = W.mesh->nv, nf = W.mesh->nf;
    CHECK(nv == 25 && nf == 32);
    memset(pins, 0, sizeof pins);
    for (i = 0; i < 3 * nv; i++) {
        x[i] = W.mesh->x[i];
        x[75 + i] = W.mesh->x[i] + (i % 3 == 1 ? 0.02 : 0.011);
        if (i % 3 == 0) pins[i / 3].vertex = i / 3, pins[i / 3].axes = CLOTH_AXIS_ALL;
    }
    for (i = 0; i < 3 * nf; i++) {
        faces[i] = W.mesh->faces[i], faces[96 + i] = W.mesh->faces[i] + nv;
        of[i / 3] = 0, of[32 + i / 3] = 1;
    }
    d.nv = 2 * nv, d.x_rest = x, d.nf = 2 * nf, d.faces = faces, d.part = of;
    d.npins = nv, d.pins = pins;
    d.contact = rung;
    k.parts = part, k.nparts = part ? 2 : 0;
    CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
    CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, &k, &W.c) == CLOTH_OK);
    for (i = nv; i < 2 * nv; i++) cloth_sim_state(W.sim)->v[3 * i + 1] = -3;
    cloth_sim_state_changed(W.sim);
    for (i = 0; i < 6 && n >= 0; i++) {
        int pairs = 0, all[2 * 64];
        n = cloth_step(W.sim, 1.0 / 240, NULL) ? -1 : 0;
        if (cloth_intersections(NULL, 2 * nv, cloth_sim_state(W.sim)->x, 2 * nf, faces, 64, all,
                                &pairs)) n = -1;
        most = pairs > most ? pairs : most;
    }
    *end = cloth_sim_state(W.sim)->x[3 * (nv + 12) + 1];
    world_close(&W);
    return n < 0 ? n : most;
}

static void groups(void) {
    cloth_collide_part part[2];
    double             end;
    memset(part, 0, sizeof part);
    part[0].self = part[1].self = 1;
    part[0].category = part[1].category = 1;
    part[0].mask = part[1].mask = 1;
    CHECK(two_sheets(CLOTH_CONTACT_SELF, NULL, &end) == 0 && end > 0);
    CHECK(two_sheets(CLOTH_CONTACT_SELF, part, &end) == 0 && end > 0);
    part[1].self = 0;                       /* collides with no cloth */
    CHECK(two_sheets(CLOTH_CONTACT_SELF, part, &end) >= 0 && end < -0.01);
    part[1].self = 1, part[1].category = 2; /* not in the other's mask, though that is in its */
    CHECK(two_sheets(CLOTH_CONTACT_SELF, part, &end) >= 0 && end < -0.01);
    part[0].mask = 3;
    CHECK(two_sheets(CLOTH_CONTACT_SELF, part, &end) == 0 && end > 0);
    CHECK(two_sheets(CLOTH_CONTACT_OBSTACLES, NULL, &end) >= 0 && end < -0.01);
}

/* The ball is nobody's business while its category is in no mask. */
static void ignored(void) {
    cloth_collide_desc  d = cloth_collide_desc_default();
    cloth_collide_part  part;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double              center[3] = {0.1, 0, 0.1}, gap;
    memset(&part, 0, sizeof part);
    part.self = 1, part.category = 4, part.mask = 1;
    d.nparts = 1, d.parts = &part;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, &d) == CLOTH_OK);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = center, o.radius = 0.05;
    CHECK(cloth_collide_add(W.c, &o, NULL) == CLOTH_ERR_MESH);
    o.category = 2;
    CHECK(cloth_collide_add(W.c, &o, NULL) == CLOTH_OK);
    o.category = 1, o.mask = 3;
    CHECK(cloth_collide_add(W.c, &o, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 4, 1.0 / 60));
    CHECK(cloth_collide_gap(W.c, 1, &gap) == CLOTH_OK && gap > 0);
    world_close(&W);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(snapshots);
    RUN(layers_share_area);
    RUN(self_penetrating);
    RUN(transplant);
    RUN(other_times);
    RUN(other_shapes);
    RUN(areas_as_added);
    RUN(removed_without_folds);
    RUN(forged);
    RUN(destruction);
    RUN(taken_away);
    RUN(record_stays);
    RUN(workers);
    RUN(row_forces);
    RUN(taken_again);
    RUN(zones_on_workers);
    RUN(zones_of_any_size);
    RUN(impact_restarts);
    RUN(cancel);
    RUN(pushed_by_a_pin);
    RUN(frozen_axes);
    RUN(finish_now);
    RUN(pinch);
    RUN(pull);
    RUN(held_by_one);
    RUN(carried_by_nothing);
    RUN(shorter);
    RUN(exempt);
    RUN(groups);
    RUN(ignored);
    return TEST_END();
}
