/* fuzz_obstacle.c - random bytes as calls on a sheet with contact: obstacles of broken meshes and
 * absurd numbers added, moved, teleported, removed; steps, snapshots and queries between them.
 *   clang -g -O1 -ffp-contract=off -fsanitize=fuzzer,address,undefined -I.. fuzz_obstacle.c \
 *       -o fuzz_obstacle -lm
 *   ./fuzz_obstacle -max_total_time=600 -max_len=1024 -len_control=0 corpus/
 * Without libFuzzer, files are replayed, or random bytes tried for N seconds:
 *   cc -std=c99 -g -O1 -ffp-contract=off -fsanitize=address,undefined -DFUZZ_MAIN -I.. \
 *       fuzz_obstacle.c -o fuzz_obstacle -lm
 *   ./fuzz_obstacle file ...        ./fuzz_obstacle -N
 * Aborts when a promise is broken: a changed hash or an obstacle after a call that failed, a
 * failure without a sentence, an accepted step with a number that is not finite, or from no
 * faces that intersect to some, another hash after save and restore or in a second
 * run, anything left allocated. */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include <stdio.h>
#include "fuzz.h"

#define FUZZ_CALLS    24                    /* of one input                                    */
#define FUZZ_SIDE     4                     /* vertices along the sheet                        */
#define FUZZ_OBSTACLES 5
#define FUZZ_V        10                    /* vertices and faces of a mesh at most            */
#define FUZZ_F        12
#define FUZZ_PATIENCE 60                    /* questions of cancel before a step is ended      */

typedef struct world {
    host           h;
    int            asked, blind;            /* blind: faces of obstacles are exempt           */
    cloth_mesh    *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle id[FUZZ_OBSTACLES];
    int            nv[FUZZ_OBSTACLES];
    double         x[FUZZ_OBSTACLES][3 * FUZZ_V];
    int            pairs;
    cloth_grid     grid[FUZZ_OBSTACLES];
    double         phi[FUZZ_OBSTACLES][27];
} world;

/* Mostly around a sheet of 0.3 m at the origin; few are absurd. */
static double number(bytes *b) {
    static const double absurd[] = {0, 1e300, -1e300, 1e-300, 5e-324, 1e154, -1e154, 1e-154, 1e9,
                                    -1e30, 1e100, 1e-9, 1.7976931348623157e308};
    const unsigned a = next(b);
    if (a < 200) return ((int)a - 100) / 320.0;
    if (a < 230) return ((int)a - 215) * 0.02 + 1e-5 * next(b);
    if (a < 250) return ldexp((int)next(b) - 128, (int)a - 247);
    if (a < 254) return absurd[next(b) % (sizeof absurd / sizeof *absurd)];
    return a == 254 ? HOST_NAN : HOST_INFINITY;
}

static int stop(void *user) { return ++((world *)user)->asked > FUZZ_PATIENCE; }

/* A call that failed has said why; some kinds of failure need no sentence. */
static void judge(world *w, cloth_status status, uint64_t before) {
    w->h.fail_at = 0;
    if (status == CLOTH_OK) require(w->h.errors == 0);
    else {
        require(cloth_sim_hash(w->sim) == before);
        require(w->h.errors > 0 || status == CLOTH_ERR_MEMORY || status == CLOTH_ERR_HANDLE ||
                status == CLOTH_ERR_UNINIT || status == CLOTH_ERR_CANCELLED ||
                status == CLOTH_ERR_STEP);
    }
}

static int find(const world *w, int wanted) {
    int i;
    for (i = 0; i < FUZZ_OBSTACLES; i++)
        if ((w->id[i].id != 0) == wanted) return i;
    return -1;
}

/* Of 3 x 3 x 3 nodes around the sheet: a half space, or wild. */
static const cloth_grid *grid_at(world *w, bytes *b, int at) {
    cloth_grid *g = w->grid + at;
    const int   wild = next(b) > 100;
    int         i;
    for (i = 0; i < 3; i++) g->n[i] = 3, g->origin[i] = wild ? number(b) : -0.3;
    g->cell = next(b) < 200 ? 0.3 : number(b);
    g->band = next(b) < 200 ? 0.3 : number(b);
    for (i = 0; i < 27; i++) w->phi[at][i] = wild ? number(b) : 0.3 * (i / 3 % 3 - 1);
    g->phi = next(b) == 255 ? NULL : w->phi[at];
    return next(b) == 255 ? NULL : g;
}

/* One of the kinds. A mesh is wild, or the faces of a strip with a byte of damage. */
static void fuzz_add(world *w, bytes *b) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    const int           at = find(w, 0);
    const uint64_t      before = cloth_sim_hash(w->sim);
    double              x[3 * FUZZ_V];
    int                 faces[3 * FUZZ_F], i, wild = (int)(next(b) & 1u), nv;
    cloth_obstacle      id;
    cloth_status        status;
    if (at < 0) return;
    d.kind = (cloth_obstacle_kind)(next(b) % 8u);
    if (d.kind == 7) d.kind = CLOTH_OBSTACLE_MESH;
    if (d.kind == CLOTH_OBSTACLE_GRID) d.grid = grid_at(w, b, at);
    d.nv = (int)(next(b) % (FUZZ_V + 1u)), d.nf = (int)(next(b) % (FUZZ_F + 1u));
    for (i = 0; i < 3 * FUZZ_V; i++) x[i] = i < 3 * d.nv || i < 24 ? number(b) : 0;
    for (i = 0; i < 3 * FUZZ_F; i++) faces[i] = 0;
    for (i = 0; i < d.nf; i++) {
        faces[3 * i] = wild ? (int)next(b) % (d.nv + 1) : i % (d.nv + !d.nv);
        faces[3 * i + 1] = wild ? (int)next(b) % (d.nv + 1) : (i + 1) % (d.nv + !d.nv);
        faces[3 * i + 2] = wild ? (int)next(b) % (d.nv + 1) : (i + 2) % (d.nv + !d.nv);
    }
    if (next(b) > 250) faces[0] = -7;
    d.x = next(b) == 255 ? NULL : x;
    d.faces = next(b) == 255 ? NULL : faces;
    d.radius = number(b);
    d.friction = next(b) < 200 ? 0.3 : number(b);
    for (i = 0; i < 3; i++) d.normal[i] = number(b);
    d.self_penetrating = next(b) > 200;
    d.mask = next(b) > 240 ? 2u : 1u;
    if (next(b) > 220) w->h.fail_at = w->h.calls + 1 + (int)(next(b) % 64u);
    status = cloth_collide_add(w->c, &d, &id);
    require((status == CLOTH_OK) == (id.id != 0));
    judge(w, status, before);
    if (status) return;
    nv = d.kind == CLOTH_OBSTACLE_MESH ? d.nv : d.kind == CLOTH_OBSTACLE_BOX ? 8
       : d.kind == CLOTH_OBSTACLE_CAPSULE ? 2 : 1;
    memcpy(w->x[at], x, sizeof x);
    w->nv[at] = nv;
    w->id[at] = id;
    w->blind |= d.self_penetrating;
}

static void fuzz_pose(world *w, bytes *b, int jump) {
    const int      at = (int)(next(b) % FUZZ_OBSTACLES), how = (int)(next(b) % 3u);
    const uint64_t before = cloth_sim_hash(w->sim);
    const double   by[3] = {0.1 * number(b), 0.1 * number(b), 0.1 * number(b)};
    double         x[3 * FUZZ_V];
    int            i;
    cloth_status   status;
    for (i = 0; i < 3 * FUZZ_V; i++)
        x[i] = i >= 3 * w->nv[at] ? 0 : how ? w->x[at][i] + by[i % 3] : number(b);
    if (next(b) > 220) w->h.fail_at = w->h.calls + 1 + (int)(next(b) % 4u);
    status = jump ? cloth_collide_teleport(w->c, w->id[at], x)
                  : cloth_collide_move(w->c, w->id[at], x);
    judge(w, status, before);
    if (!status) memcpy(w->x[at], x, sizeof x);
}

/* -1 where what the fuzzer wrote into x is refused. */
static int pairs_now(world *w) {
    const cloth_status status = cloth_collide_intersections(w->c, 0, NULL, &w->pairs);
    if (status == CLOTH_ERR_NONFINITE || status == CLOTH_ERR_ARGUMENT) return -1;
    require(status == CLOTH_OK && w->pairs >= 0);
    return w->pairs;
}

static void fuzz_step(world *w, bytes *b, int halvings) {
    const uint64_t before = cloth_sim_hash(w->sim);
    const double   h = next(b) < 230 ? 0.01 : number(b);
    cloth_state   *s = cloth_sim_state(w->sim);
    const int      nv = FUZZ_SIDE * FUZZ_SIDE;
    cloth_report   r;
    cloth_status   status;
    int            i, m = pairs_now(w);
    w->asked = 0;
    if (next(b) > 220) w->h.fail_at = w->h.calls + 1 + (int)(next(b) % 16u);
    status = halvings ? cloth_collide_step(w->c, h, halvings, &r) : cloth_step(w->sim, h, &r);
    require(r.status == status);
    if (halvings && !status) host_forget(&w->h);    /* what the longer steps said */
    judge(w, status, before);
    if (status) return;
    for (i = 0; i < 3 * nv; i++) require(clothi_finite(s->x[i]) && clothi_finite(s->v[i]));
    if (m == 0 && !w->blind) require(pairs_now(w) == 0);
}

static void fuzz_untangle(world *w, bytes *b) {
    const uint64_t before = cloth_sim_hash(w->sim);
    const double   max_move = next(b) < 200 ? 0 : number(b);
    cloth_status   status;
    w->asked = 0;
    if (next(b) > 220) w->h.fail_at = w->h.calls + 1 + (int)(next(b) % 16u);
    status = cloth_collide_untangle(w->c, max_move, NULL);
    judge(w, status, before);
    if (!status)
        require(clothi_find_nonfinite(cloth_sim_state(w->sim)->x, 3 * FUZZ_SIDE * FUZZ_SIDE) < 0);
}

/* Whatever the last call left, queries answer. */
static void fuzz_ask(world *w, bytes *b) {
    cloth_collide_contact contact[8];
    cloth_collide_pair pair[8];
    cloth_hold         hold[8];
    double             f[3 * FUZZ_SIDE * FUZZ_SIDE], gap;
    int                count, pairs[4];
    const uint64_t     before = cloth_sim_hash(w->sim);
    require(cloth_collide_contacts(w->c, (int)(next(b) % 9u), contact, &count) == CLOTH_OK);
    require(cloth_collide_holds(w->c, (int)(next(b) % 9u), hold, &count) == CLOTH_OK);
    require(cloth_collide_failed(w->c, (int)(next(b) % 9u), pair, &count) == CLOTH_OK);
    require(cloth_collide_forces(w->c, f) == CLOTH_OK);
    require(cloth_collide_friction(w->c, f) == CLOTH_OK);
    (void)cloth_collide_gap(w->c, number(b), &gap);
    (void)cloth_collide_intersections(w->c, (int)(next(b) % 3u), pairs, &count);
    (void)pairs_now(w);
    require(cloth_collide_exempt(w->c, (int)(next(b) % 9u), pair, &count) == CLOTH_OK);
    require(cloth_sim_hash(w->sim) == before);
    host_forget(&w->h);
}

/* There and back; then a vertex where bytes say. */
static void fuzz_state(world *w, bytes *b) {
    const size_t   size = cloth_sim_save_size(w->sim);
    const uint64_t before = cloth_sim_hash(w->sim);
    void          *buf = malloc(size);
    cloth_state   *s = cloth_sim_state(w->sim);
    int            i = 3 * (int)(next(b) % (FUZZ_SIDE * FUZZ_SIDE));
    require(buf && cloth_sim_save(w->sim, buf, size) == CLOTH_OK);
    s->x[i] += 0.1 * number(b), s->x[i + 1] += 0.1 * number(b);
    cloth_sim_state_changed(w->sim);
    if (next(b) > 40) {
        require(cloth_sim_restore(w->sim, buf, size) == CLOTH_OK);
        require(cloth_sim_hash(w->sim) == before);
    }
    free(buf);
}

static void fuzz_call(world *w, bytes *b) {
    const unsigned what = next(b) % 16u;
    int            at;
    host_forget(&w->h);
    if (what < 4) fuzz_add(w, b);
    else if (what < 7) fuzz_pose(w, b, 0);
    else if (what == 7) fuzz_pose(w, b, 1);
    else if (what < 11) fuzz_step(w, b, 0);
    else if (what == 11) fuzz_untangle(w, b);
    else if (what == 12) fuzz_step(w, b, 1 + (int)(next(b) % 3u));
    else if (what == 13) fuzz_ask(w, b);
    else if (what == 14) fuzz_state(w, b);
    else {
        const uint64_t before = cloth_sim_hash(w->sim);
        cloth_status   status;
        at = (int)(next(b) % FUZZ_OBSTACLES);
        if (next(b) > 220) w->h.fail_at = w->h.calls + 1 + (int)(next(b) % 40u);
        status = cloth_collide_remove(w->c, w->id[at]);
        judge(w, status, before);
        if (!status) w->id[at].id = 0;
    }
    w->h.fail_at = 0;
}

static uint64_t run(world *w, bytes b) {
    const unsigned     how = next(&b);
    cloth_desc         d = cloth_desc_default();
    cloth_collide_desc k = cloth_collide_desc_default();
    uint64_t           hash = 0;
    int                i;
    memset(w, 0, sizeof *w);
    d.hooks = fuzz_hooks(&w->h);
    d.hooks.cancel.fn = stop;
    d.hooks.cancel.user = w;
    require(cloth_mesh_sheet(&d.hooks, CLOTH_SHEET_ALTERNATING, FUZZ_SIDE, FUZZ_SIDE, 0.3, 0.3,
                             &w->mesh) == CLOTH_OK);
    d.nv = w->mesh->nv, d.x_rest = w->mesh->x, d.nf = w->mesh->nf, d.faces = w->mesh->faces;
    d.integrator = (cloth_integrator)(1 + how % 3u);
    d.contact = how & 64u ? CLOTH_CONTACT_OBSTACLES : CLOTH_CONTACT_SELF;
    d.material.membrane = 300;
    k.initial = how & 128u ? CLOTH_INITIAL_EXEMPT : CLOTH_INITIAL_REFUSE;
    if (how & 32u) k.thickness = fabs(number(&b));
    if (how & 16u) k.friction = number(&b);
    require(cloth_model_create(&d, &w->model) == CLOTH_OK);
    require(cloth_sim_create(w->model, &w->sim) == CLOTH_OK);
    if (cloth_collide_create(w->sim, &k, &w->c) == CLOTH_OK) {
        for (i = 0; i < FUZZ_CALLS && b.p < b.end; i++) fuzz_call(w, &b);
        hash = cloth_sim_hash(w->sim);
    } else require(!w->c && w->h.errors > 0);
    cloth_collide_destroy(w->c);
    cloth_sim_destroy(w->sim);
    cloth_model_destroy(w->model);
    cloth_mesh_destroy(&d.hooks, w->mesh);
    require(w->h.live == 0);
    return hash;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static world w;
    bytes        b;
    uint64_t     hash;
    b.p = data;
    b.end = data + size;
    hash = run(&w, b);
    require(run(&w, b) == hash);
    return 0;
}

#ifdef FUZZ_MAIN
int main(int argc, char **argv) {
    if (argc < 2 || argv[1][0] != '-') return fuzz_replay(argc - 1, argv + 1, "fuzz_obstacle");
    fuzz_random(atof(argv[1] + 1), 220, "fuzz_obstacle");
    return 0;
}
#endif
