/* fuzz_host.h - of fuzz_host.c: a host whose allocator keeps accounts and whose term has a state,
 * the numbers that bytes stand for, what must be true of a call and of a step.
 * Include after clothsim_collide.h, in one .c file per program. */
#ifndef CLOTH_TEST_FUZZ_HOST_H
#define CLOTH_TEST_FUZZ_HOST_H

#include <stdio.h>
#include "fuzz.h"

enum { FUZZ_HEAD = 32, FUZZ_SLICE = 20, FUZZ_CALLS = 48, FUZZ_THINGS = 4, FUZZ_V = 40,
       FUZZ_PAIRS = 4096, FUZZ_PATIENCE = 60 };

typedef enum fate { DONE, FAILED, ASKED } fate;

typedef struct known {                      /* what a restore brings back with the state       */
    cloth_attachment tie[FUZZ_THINGS];
    double           x[FUZZ_THINGS][24], goal[3 * FUZZ_V];
    unsigned         pin[FUZZ_V];
} known;

typedef struct fuzz_body {
    cloth_sim     *sim;
    cloth_collide *c, *old;                 /* old: the sim has it no more                     */
    cloth_obstacle id[FUZZ_THINGS];
    known          k, kept_k;
    void          *kept;                    /* a snapshot                                      */
    size_t         kept_size;
    uint64_t       kept_hash;
    int            layout, kept_at, kept_layout;    /* layout: of what no snapshot brings back */
    int64_t        steps, has_term;         /* the state of its term; whether it has one       */
} fuzz_body;

typedef struct world {
    host         h;
    size_t       bytes[3];                  /* of the model and of each body                   */
    int          account, hit, odd;         /* hit: an allocation failed; odd: NaN, infinities */
    int          asked, patience, answer;   /* of cancel                                       */
    int          second, at;                /* the second run; which call                      */
    int          whose[FUZZ_CALLS], idle[FUZZ_CALLS];   /* of the first run: nothing came of it */
    uint64_t     before, after[FUZZ_CALLS];
    double       v0[3 * FUZZ_V];
    cloth_mesh  *mesh;
    cloth_desc   d;
    cloth_model *model;
    fuzz_body    body[2];
    host_reverse workers;
} world;

/* --- the host --- */

typedef union block {
    struct { size_t size; int account; } is;
    double align[2];
} block;

static void *world_alloc(size_t size, void *user) {
    world *w = (world *)user;
    block *p = (block *)host_alloc(size + sizeof *p, &w->h);
    w->hit |= p == NULL;
    if (!p) return NULL;
    if (w->second) memset(p, 0x3f, size + sizeof *p);
    p->is.size = size, p->is.account = w->account;
    w->bytes[w->account] += size;
    return p + 1;
}

static void world_free(void *ptr, size_t size, void *user) {
    world *w = (world *)user;
    block *p = (block *)ptr - 1;
    require(p->is.size == size);
    w->bytes[p->is.account] -= size;
    host_free(p, size + sizeof *p, &w->h);
}

static int world_stop(void *user) {
    world *w = (world *)user;
    return ++w->asked > w->patience ? w->answer : 0;
}

/* A term whose state counts substeps and says where it pulls. */
static cloth_status tug_begin(void *user, const cloth_eval *e) {
    ((fuzz_body *)user)->steps += e->h > 0;
    return CLOTH_OK;
}

static cloth_status tug_eval(void *user, const cloth_eval *e, double *energy) {
    const double r = e->x[1] - 0.01 * (double)(((fuzz_body *)user)->steps % 5);
    const double k[9] = {0, 0, 0, 0, 10, 0, 0, 0, 0};
    const int    v = 0;
    *energy = 5 * r * r;
    if (e->grad) e->grad[1] += 10 * r;
    return e->hess ? cloth_matrix_add_element(e->hess, 1, &v, k) : CLOTH_OK;
}

static size_t tug_size(void *user) { return sizeof ((fuzz_body *)user)->steps; }
static void tug_save(void *user, void *buf) {
    memcpy(buf, &((fuzz_body *)user)->steps, tug_size(user));
}
static void tug_load(void *user, const void *buf) {
    memcpy(&((fuzz_body *)user)->steps, buf, tug_size(user));
}

static int finite_number(double x) { return fabs(x) <= 1.7976931348623157e308; }

/* Mostly up to a quarter; few are absurd, w->odd counts what is not finite. */
static double number(world *w, bytes *b) {
    static const double absurd[] = {0, 1e300, -1e300, 5e-324, 1e154, -1e-154, 1e9, -1e30, 1e-9};
    const unsigned a = next(b);
    if (a < 230) return ((int)a - 115) / 460.0;
    if (a < 242) return ldexp((int)next(b) - 128, (int)a - 236);
    if (a < 252) return absurd[next(b) % (sizeof absurd / sizeof *absurd)];
    w->odd++;
    return a < 254 ? HOST_NAN : HOST_INFINITY;
}

static void numbers(world *w, bytes *b, int n, double scale, double *x) {
    while (n-- > 0) *x++ = scale * number(w, b);
}

/* in 0 .. n - 1, now and then beside it */
static int choice(bytes *b, int n) {
    static const int beside[] = {-1, 0x7fffffff, -0x7fffffff - 1};
    const unsigned   k = next(b);
    return k < 250 ? (int)k % n : k < 253 ? beside[k - 250] : n;
}

/* --- what must be true --- */

/* Of a call with its status; leapfrog may have tried a step with fewer substeps before. */
static fate judge(world *w, fuzz_body *b, cloth_status s) {
    w->h.fail_at = 0;
    if (s == CLOTH_OK) {
        require(!w->hit && (!w->h.errors || w->d.integrator == CLOTH_INTEGRATOR_LEAPFROG));
        return DONE;
    }
    require(cloth_sim_hash(b->sim) == w->before);
    require(w->hit || s != CLOTH_ERR_MEMORY);
    require(w->h.errors || s == CLOTH_ERR_MEMORY || s == CLOTH_ERR_CANCELLED);
    return FAILED;
}

/* Of a call that reads all numbers that were drawn. */
static fate judge_all(world *w, fuzz_body *b, cloth_status s) {
    require(s != CLOTH_OK || w->odd == 0);
    return judge(w, b, s);
}

/* Faces that intersect after an accepted step are exempt. */
static void check_pairs(fuzz_body *b) {
    static int                pairs[2 * FUZZ_PAIRS];
    static cloth_collide_pair e[FUZZ_PAIRS];
    const int nf = cloth_model_topology(cloth_sim_model(b->sim))->nf;
    int       i, j, n, m;
    if (cloth_collide_intersections(b->c, FUZZ_PAIRS, pairs, &n)) return;    /* too far out */
    require(cloth_collide_exempt(b->c, FUZZ_PAIRS, e, &m) == CLOTH_OK);
    require(n <= FUZZ_PAIRS && m <= FUZZ_PAIRS);
    for (i = 0; i < 2 * n; i += 2) {
        const int self = pairs[i + 1] < nf;
        for (j = 0; j < m; j++)
            if (e[j].faces && self == !e[j].obstacle.id &&
                (e[j].a == pairs[i] || (!self && e[j].b == pairs[i])) &&
                (!self || e[j].b == pairs[i + 1]))
                break;
        require(j < m);
    }
}

/* Euler's objective falls: what is left of the energy, and the kinetic energy of the change of v,
 * are not more than the energy before, where nothing else works. */
static void check_energy(world *w, fuzz_body *b, const cloth_report *r, const cloth_ledger *was) {
    const cloth_ledger *l = &r->energy;
    const double       *v = cloth_sim_state(b->sim)->v, *mass = cloth_sim_params(b->sim)->mass;
    const double        other = fabs(l->wind_work) + fabs(l->force_work) + fabs(l->pin_work) +
                                fabs(l->contact_work) + l->zone_loss + was->attach;
    double left = l->total - l->kinetic;
    int    i;
    if (w->d.integrator != CLOTH_INTEGRATOR_EULER || r->substeps != 1 || w->answer == 2 ||
        r->outcome != CLOTH_STEP_CONVERGED || r->contacts > 0 || other > 0 || b->has_term)
        return;
    for (i = 0; i < 3 * w->mesh->nv; i++)
        left += 0.5 * mass[i / 3] * (v[i] - w->v0[i]) * (v[i] - w->v0[i]);
    require(left <= was->total + 1e-9 * (1 + fabs(left) + was->kinetic + fabs(was->gravity)));
}

static void check_step(world *w, fuzz_body *b, const cloth_report *r, const cloth_ledger *was,
                       int pins) {
    const cloth_state *s = cloth_sim_state(b->sim);
    int                i;
    for (i = 0; i < 3 * w->mesh->nv; i++) {
        require(finite_number(s->x[i]) && finite_number(s->v[i]));
        if (pins && (b->k.pin[i / 3] >> (i % 3) & 1) && was->kinetic + r->energy.kinetic < 1e6)
            require(fabs(s->x[i] - b->k.goal[i]) <= 1e-12 * (1 + fabs(b->k.goal[i])));
    }
    check_energy(w, b, r, was);
    if (b->c) check_pairs(b);
}

#endif
