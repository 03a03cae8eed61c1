/* random_scenes.c - what holds in every scene, in scenes that nobody thought of.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. stability/random_scenes.c -lm
 * tier: default
 *
 * A seed draws cloth (one sheet or two, stiffness, thickness, substeps, integrator), one to three
 * things below it that swing and spin (planes, spheres, boxes, balls as meshes, some flagged
 * self_penetrating), and what a host does between steps: a shorter step, pins, a teleport, other
 * material and gravity, velocities written. A twin is told the same by a host of its own, whose
 * workers come last first and whose allocator fails at times. Asked of every step:
 *
 *   crossings  none that is new, by exact arithmetic; and the kit counts them as exact.h does
 *   twin       the same status and the same hash; where memory fails, the hash from before
 *   replay     what was saved by the one and restored in the other leads to the same hash again
 *   contacts   unit normals, weights that balance, no force that pulls
 *   the end    nothing is left in the twin's heap
 *
 * A step that fails is no mistake where things that move squeeze cloth between them, or meet a pin
 * that does not: in scenes with one thing and without pins none may.
 * FULL=1: 60 seeds of 60 steps, four minutes; else 4 of 24. FIRST=SEED, SEEDS=N change that. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "../shapes.h"
#include "../exact.h"
#include "../stage.h"
#include "../host.h"
#include "../reference.h"

typedef struct swing {                      /* of a thing, about where it begins               */
    double *x;                              /* [nv x 3] at t = 0                               */
    double  middle[3], way[3], rate, spin;  /* m, m, 1/s, rad                                  */
} swing;

typedef struct play {
    unsigned long long seed;
    stage          s;                       /* examined                                        */
    swing          ways[STAGE_THINGS];
    host           memory;                  /* of the twin                                     */
    host_reverse   workers;
    cloth_desc     desc;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle id[STAGE_THINGS];
    void          *saved;
    size_t         size;
    double         t;
    int            replayed, starved, refused, contacts, pins;
} play;

static double draw(play *p, double a, double b) { return ref_uniform(&p->seed, a, b); }
static int    one_of(play *p, int n) { return (int)draw(p, 0, n - 1e-9); }

/* --- the scene --- */

static void draw_cloth(play *p) {
    static const cloth_integrator by[5] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                           CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_EULER,
                                           CLOTH_INTEGRATOR_LEAPFROG};
    stage *s = &p->s;
    int    i, n;
    if (one_of(p, 3) == 0) stage_layers(s, 2, 5 + one_of(p, 4), draw(p, -0.02, 0.02));
    else {
        n = 6 + one_of(p, 7);
        stage_sheet(s, n, 0.4);
        for (i = 0; i < s->mesh->nv; i++)
            s->mesh->x[3 * i] -= 0.2, s->mesh->x[3 * i + 1] = 0.02, s->mesh->x[3 * i + 2] -= 0.2;
    }
    s->contact.thickness = pow(10, draw(p, -3, -2.3));
    s->desc.material.membrane = pow(10, draw(p, 2, 3.7));
    s->desc.material.bending = pow(10, draw(p, -6, -4));
    s->desc.material.damping = one_of(p, 2) ? 0 : 0.01;
    s->desc.integrator = by[one_of(p, 5)];
    s->desc.substeps = s->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG ? 0 : 1 + one_of(p, 2);
    s->desc.hooks.log.fn = NULL;
    p->desc = s->desc;
    p->desc.hooks = host_hooks(&p->memory);
    host_turn_round(&p->desc.hooks, &p->workers, 3);
    if (!stage_start(s)) exit(2);
    CHECK(cloth_model_create(&p->desc, &p->model) == CLOTH_OK);
    CHECK(cloth_sim_create(p->model, &p->sim) == CLOTH_OK);
    CHECK(cloth_collide_create(p->sim, &s->contact, &p->c) == CLOTH_OK);
}

/* A thing of radius r, or as wide either way, its top `room` m below y = 0; a plane at -0.3 m. */
static void draw_thing(play *p, int k) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    const double        r = draw(p, 0.04, 0.1), room = draw(p, 0.005, 0.03);
    double              lo[3], hi[3], x[3];
    shape               m = {0, 0, NULL, NULL};
    swing              *w = p->ways + k;
    int                 i, kind = one_of(p, 4);
    x[0] = draw(p, -0.15, 0.15), x[1] = -r - room, x[2] = draw(p, -0.15, 0.15);
    for (i = 0; i < 3; i++) lo[i] = x[i] - r, hi[i] = x[i] + r;
    d.friction = draw(p, 0, 1);
    d.x = x, d.radius = r;
    if (kind == 0) d.kind = CLOTH_OBSTACLE_PLANE, x[1] = -0.3;
    else if (kind == 1) d.kind = CLOTH_OBSTACLE_SPHERE;
    else {
        if (kind == 2) shape_box(&m, lo, hi);
        else shape_sphere(&m, x, r, 8);
        d.x = m.x, d.nv = m.nv, d.faces = m.faces, d.nf = m.nf;
        d.self_penetrating = p->desc.integrator != CLOTH_INTEGRATOR_LEAPFROG && one_of(p, 2);
    }
    (void)stage_add(&p->s, &d);
    CHECK(cloth_collide_add(p->c, &d, p->id + k) == CLOTH_OK);
    w->x = (double *)malloc(3 * (size_t)p->s.thing[k].nv * sizeof(double));
    if (!w->x) exit(2);
    memcpy(w->x, d.x, 3 * (size_t)p->s.thing[k].nv * sizeof(double));
    memcpy(w->middle, x, sizeof w->middle);
    for (i = 0; i < 3; i++) w->way[i] = draw(p, -0.06, 0.06) * (kind == 0 && i != 1 ? 0 : 1);
    w->rate = draw(p, 0, 10), w->spin = kind > 1 ? draw(p, -0.5, 0.5) : 0;
    shape_free(&m);
}

/* Where thing k is at t: on its way there and back, turned about y. */
static void swing_to(play *p, int k, double t) {
    const swing *w = p->ways + k;
    const double part = sin(w->rate * t), a = w->spin * part;
    int          i;
    for (i = 0; i < p->s.thing[k].nv; i++) {
        const double *x = w->x + 3 * i, u = x[0] - w->middle[0], v = x[2] - w->middle[2];
        double       *y = p->s.thing[k].next + 3 * i;
        y[0] = w->middle[0] + w->way[0] * part + cos(a) * u - sin(a) * v;
        y[1] = x[1] + w->way[1] * part;
        y[2] = w->middle[2] + w->way[2] * part + sin(a) * u + cos(a) * v;
    }
}

/* --- what a host does --- */

/* Told both; the same answer and, where it is no, the same state as before. */
static void alike(play *p, cloth_status one, cloth_status other, uint64_t before) {
    CHECK(one == other);
    CHECK(cloth_sim_hash(p->s.sim) == cloth_sim_hash(p->sim));
    if (one) CHECK(cloth_sim_hash(p->s.sim) == before);
    p->refused += one != CLOTH_OK;
}

static void host_does(play *p) {
    stage          *s = &p->s;
    const uint64_t  before = cloth_sim_hash(s->sim);
    const int       v = one_of(p, s->mesh->nv), what = one_of(p, 12);
    cloth_material  m = s->desc.material;
    double          g[3], *x = s->state->x + 3 * v;
    stage_thing    *t = s->thing;
    cloth_status    status;
    int             i;
    if (what == 0 && p->pins) {
        alike(p, cloth_sim_pin(s->sim, v, CLOTH_AXIS_ALL, x),
              cloth_sim_pin(p->sim, v, CLOTH_AXIS_ALL, x), before);
    }
    if (what == 1) alike(p, cloth_sim_unpin(s->sim, v), cloth_sim_unpin(p->sim, v), before);
    if (what == 2) {
        m.membrane *= draw(p, 0.5, 2);
        alike(p, cloth_sim_set_material(s->sim, 0, &m), cloth_sim_set_material(p->sim, 0, &m),
              before);
    }
    if (what == 3) {
        for (i = 0; i < 3; i++) g[i] = draw(p, -3, 3) - (i == 1 ? 8 : 0);
        alike(p, cloth_sim_set_gravity(s->sim, g), cloth_sim_set_gravity(p->sim, g), before);
    }
    if (what == 4) {
        for (i = 0; i < 3; i++) g[i] = draw(p, -1, 1);
        for (i = 0; i < 3 * s->mesh->nv; i++)
            s->state->v[i] += g[i % 3], cloth_sim_state(p->sim)->v[i] += g[i % 3];
        cloth_sim_state_changed(s->sim);
        cloth_sim_state_changed(p->sim);
    }
    if (what == 5) {                        /* where cloth would cross it is refused */
        for (i = 0; i < 3; i++) g[i] = draw(p, -0.02, 0.02);
        for (i = 0; i < 3 * t->nv; i++) t->next[i] = t->x[i] + g[i % 3];
        status = cloth_collide_teleport(s->c, t->id, t->next);
        alike(p, status, cloth_collide_teleport(p->c, p->id[0], t->next), before);
        if (!status) memcpy(t->x, t->next, 3 * (size_t)t->nv * sizeof(double));
    }
}

/* --- a step --- */

/* fail_in > 0: of a step's allocations that one fails; a whole step then, or halves of it would be
 * state. */
static cloth_status twin_step(play *p, double h, int fail_in) {
    uint64_t     before;
    cloth_status status;
    int          k;
    for (k = 0; k < p->s.nthing; k++)
        CHECK(cloth_collide_move(p->c, p->id[k], p->s.thing[k].next) == CLOTH_OK);
    before = cloth_sim_hash(p->sim);
    p->memory.fail_at = fail_in ? p->memory.calls + fail_in : 0;
    status = fail_in ? cloth_step(p->sim, h, NULL) : cloth_collide_step(p->c, h, 6, NULL);
    p->memory.fail_at = 0;
    if (status) CHECK(cloth_sim_hash(p->sim) == before);
    return status;
}

/* The twin takes it first: with too little memory, or twice, the second time from what the other
 * has saved. */
static cloth_status twin_first(play *p, double h) {
    const int      how = one_of(p, 6);
    const uint64_t before = cloth_sim_hash(p->sim);
    cloth_status   status;
    uint64_t       after;
    if (how == 0) {
        status = twin_step(p, h, 1 + one_of(p, 6));
        p->starved += status == CLOTH_ERR_MEMORY;
        return status ? twin_step(p, h, 0) : status;
    }
    status = twin_step(p, h, 0);
    if (how > 1 || status) return status;
    after = cloth_sim_hash(p->sim);
    if (cloth_sim_save_size(p->s.sim) > p->size) {
        p->size = cloth_sim_save_size(p->s.sim);
        p->saved = realloc(p->saved, p->size);
        if (!p->saved) exit(2);
    }
    CHECK(cloth_sim_save(p->s.sim, p->saved, p->size) == CLOTH_OK);
    CHECK(cloth_sim_restore(p->sim, p->saved, p->size) == CLOTH_OK);
    CHECK(cloth_sim_hash(p->sim) == before);
    status = twin_step(p, h, 0);
    CHECK(cloth_sim_hash(p->sim) == after);
    p->replayed++;
    return status;
}

static void contacts_hold(play *p) {
    static cloth_collide_contact touch[4096];
    int                          i, k, n = 0;
    CHECK(cloth_collide_contacts(p->s.c, 4096, touch, &n) == CLOTH_OK);
    for (i = 0; i < n && i < 4096; i++) {
        const cloth_collide_contact *q = touch + i;
        double                       sum = 0, size = 0;
        for (k = 0; k < q->n; k++) sum += q->weight[k];
        for (k = 0; k < 3; k++) size += q->normal[k] * q->normal[k];
        if (!CHECK(fabs(fabs(sum) - (q->pair.obstacle.id > 0)) < 1e-9)) break;
        if (!CHECK(fabs(size - 1) < 1e-9 && q->force >= 0 && q->gap < 1)) break;
    }
    p->contacts += n;
}

static void run(unsigned long long seed, int steps) {
    play         p;
    int          i, k, bad = 0, things;
    memset(&p, 0, sizeof p);
    p.seed = seed;
    draw_cloth(&p);
    things = 1 + one_of(&p, 3);
    p.pins = one_of(&p, 2);
    for (k = 0; k < things; k++) draw_thing(&p, k);
    for (i = 0; i < steps; i++) {
        const double h = one_of(&p, 5) ? 1.0 / 60 : draw(&p, 1e-3, 1.0 / 60);
        const int    failed = p.s.failed;
        cloth_status status;
        host_does(&p);
        p.t += h;
        for (k = 0; k < things; k++) swing_to(&p, k, p.t);
        status = twin_first(&p, h);
        (void)stage_step(&p.s, h);
        bad += cloth_sim_hash(p.s.sim) != cloth_sim_hash(p.sim);
        bad += (p.s.failed > failed) != (status != CLOTH_OK);
        contacts_hold(&p);
    }
    printf("    %4llu  %d  %4d  %d  %5d %6d %6d  %5d %5d %5d  %6d\n", seed,
           (int)p.desc.integrator, p.s.mesh->nv, things, p.s.steps, p.s.shorter, p.s.failed,
           p.replayed, p.starved, p.refused, p.contacts);
    fflush(stdout);
    CHECK(bad == 0 && p.s.new_pairs == 0 && p.s.inside == 0 && p.s.miscounted == 0);
    if (things == 1 && !p.pins) CHECK(p.s.failed == 0);
    cloth_collide_destroy(p.c);
    cloth_sim_destroy(p.sim);
    cloth_model_destroy(p.model);
    CHECK(p.memory.live == 0 && p.memory.bytes == 0);
    for (k = 0; k < things; k++) free(p.ways[k].x);
    free(p.saved);
    stage_end(&p.s);
}

static void scenes(void) {
    const char *first = getenv("FIRST"), *seeds = getenv("SEEDS");
    const int   from = first ? atoi(first) : 1;
    const int   n = seeds ? atoi(seeds) : test_full() ? 60 : 4;
    int         i;
    printf("    seed by    nv  things steps  cut failed  twice starved no  contacts\n");
    for (i = 0; i < n; i++) run((unsigned long long)(from + i), test_full() ? 60 : 24);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(scenes);
    return TEST_END();
}
