/* test_memory.c - fails the allocator at its first, second, third ... call in everything that
 * allocates: the status says so, nothing leaks, the state has its hash, the next call works.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_memory.c \
 *      -o test_memory -lm && ./test_memory */
#include "clothsim.h"
#include "test.h"
#include "scene.h"

static host        told;
static cloth_hooks hooks;
static scene       S;

#define MOST_CALLS 400

/* The allocator fails at its n-th call from now. */
static void fail_in(int n) { told.fail_at = told.calls + n; }
static void fail_never(void) { told.fail_at = 0; }

static void fresh(int m, int b, int kind, int with) {
    hooks = host_hooks(&told);
    S = scene_make(4, (cloth_membrane)m, (cloth_bend_model)b, (cloth_integrator)kind, &hooks,
                   with);
}

static void done(void) {
    scene_close(&S);
    CHECK(told.live == 0);
}

/* --- create --- */

static void model_create(void) {
    int kind, b, n = 0, total = 0;
    FOR_INTEGRATORS(kind)
        for (b = CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++) {
            cloth_tie    tie = {1, 2, CLOTH_AXIS_Y};
            double       mass[40];
            cloth_model *m = NULL;
            cloth_status status;
            int          i;
            hooks = host_hooks(&told);
            scene_desc(&S, 4, &hooks, WITH_ALL);
            for (i = 0; i < 40; i++) mass[i] = 1e-3;
            S.desc.vertex_mass = mass;
            S.desc.integrator = (cloth_integrator)kind;
            S.desc.bend = (cloth_bend_model)b;
            S.desc.ties = &tie;
            S.desc.nties = kind != CLOTH_INTEGRATOR_LEAPFROG;
            for (n = 1; n < MOST_CALLS; n++) {
                host_forget(&told);
                fail_in(n);
                status = cloth_model_create(&S.desc, &m);
                fail_never();
                if (status == CLOTH_OK) break;
                CHECK(status == CLOTH_ERR_MEMORY && !m && told.live == 0 && told.errors > 0);
            }
            CHECK(n > 10 && n < MOST_CALLS);
            total += n;
            cloth_model_destroy(m);
            CHECK(told.live == 0);
            done();
        }
    printf("  %d failing calls\n", total);
}

static void sim_create(void) {
    int          n;
    cloth_sim   *s;
    cloth_status status = CLOTH_ERR_MEMORY;
    long long    held;
    fresh(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_BDF2, WITH_ALL);
    held = told.live;
    for (n = 1; n < MOST_CALLS && status; n++) {
        s = (cloth_sim *)&n;
        fail_in(n);
        status = cloth_sim_create(S.model, &s);
        fail_never();
        CHECK(status == CLOTH_OK || (status == CLOTH_ERR_MEMORY && !s && told.live == held));
    }
    CHECK(n > 10 && n < MOST_CALLS);
    cloth_sim_destroy(s);
    CHECK(told.live == held);
    done();
}

/* --- a host's term that couples far vertices, and needs memory of its own now and then --- */

typedef struct host_rope {
    const cloth_hooks *hooks;
    double             state;
} host_rope;

static cloth_status rope_begin(void *user, const cloth_eval *e) {
    host_rope *r = (host_rope *)user;
    void      *block = r->hooks->allocator.alloc(64, r->hooks->allocator.user);
    r->state += e->h;                       /* also when the step comes to nothing */
    if (!block) return CLOTH_ERR_MEMORY;
    r->hooks->allocator.free(block, 64, r->hooks->allocator.user);
    return CLOTH_OK;
}

static cloth_status rope_eval(void *user, const cloth_eval *e, double *energy) {
    double H[36] = {0};
    int    i, k;
    (void)user;
    *energy = 0;
    for (k = 0; k < 3; k++) {               /* several pairs: the list has to grow */
        int v[2];
        v[0] = k;
        v[1] = e->nv - 1 - k;
        for (i = 0; i < 3; i++) {
            double d = e->x[3 * v[0] + i] - e->x[3 * v[1] + i];
            *energy += 0.5 * d * d;
            if (e->grad) e->grad[3 * v[0] + i] += d;
            if (e->grad) e->grad[3 * v[1] + i] -= d;
            H[6 * i + i] = H[6 * (i + 3) + i + 3] = 1;
            H[6 * i + i + 3] = H[6 * (i + 3) + i] = -1;
        }
        if (e->hess) {
            cloth_status status = cloth_matrix_add_element(e->hess, 2, v, H);
            if (status) return status;
        }
    }
    return CLOTH_OK;
}

static size_t rope_size(void *user) { (void)user; return sizeof(double); }
static void rope_save(void *user, void *buf) { memcpy(buf, &((host_rope *)user)->state, 8); }
static void rope_load(void *user, const void *buf) {
    memcpy(&((host_rope *)user)->state, buf, 8);
}

static void add_rope(host_rope *rope) {
    cloth_term term;
    memset(&term, 0, sizeof term);
    rope->hooks = &hooks;
    rope->state = 1;
    term.name = "rope";
    term.user = rope;
    term.begin = rope_begin;
    term.eval = rope_eval;
    term.save_size = rope_size;
    term.save = rope_save;
    term.load = rope_load;
    CHECK(cloth_sim_add_term(S.sim, &term) == CLOTH_OK);
}

/* --- the first step, for each n in a sim that has not made one --- */

typedef cloth_status run_fn(cloth_report *r);

static cloth_status run_step(cloth_report *r) { return cloth_step(S.sim, 0.004, r); }
static cloth_status run_static(cloth_report *r) { return cloth_solve_static(S.sim, r); }
static cloth_status run_energy(cloth_report *r) { return cloth_sim_energy(S.sim, &r->energy); }
static cloth_status run_potential(cloth_report *r) {
    return cloth_sim_potential(S.sim, cloth_sim_state(S.sim)->x, &r->energy.total, NULL);
}

/* Returns how many calls could fail. expect: after a failure the same call gives this hash. */
static int fail_each(int m, int b, int kind, int with, int rope_on, run_fn *run) {
    uint64_t     expect = 0, before;
    cloth_report r;
    cloth_status status;
    host_rope    rope;
    int          n;
    for (n = 0; n < MOST_CALLS; n++) {
        fresh(m, b, kind, with);
        if (rope_on) add_rope(&rope);
        before = cloth_sim_hash(S.sim);
        if (n > 0) fail_in(n);
        status = run(&r);
        if (told.fail_at && told.calls < told.fail_at) {        /* nothing failed any more */
            done();
            return n - 1;
        }
        fail_never();
        if (n > 0) {
            if (status != CLOTH_ERR_MEMORY || cloth_sim_hash(S.sim) != before)
                printf("  call %d: status %d, state %s\n", n, (int)status,
                       cloth_sim_hash(S.sim) == before ? "kept" : "changed");
            CHECK(status == CLOTH_ERR_MEMORY && (told.errors > 0 || rope_on));
            CHECK(cloth_sim_hash(S.sim) == before);
            status = run(&r);
        }
        CHECK(status == CLOTH_OK);
        if (n == 0) expect = cloth_sim_hash(S.sim);
        CHECK(cloth_sim_hash(S.sim) == expect);
        done();
    }
    return n;
}

static void first_step(void) {
    int kind, m, b, total = 0;
    FOR_INTEGRATORS(kind)
        for (m = CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++)
            for (b = CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++) {
                int n = fail_each(m, b, kind, WITH_ALL, 0, run_step);
                CHECK(n > 5 && n < MOST_CALLS);
                total += n;
                n = fail_each(m, b, kind, WITH_PINS, 0, run_step);
                CHECK(n > 5 && n < MOST_CALLS);
                total += n;
            }
    printf("  %d failing calls\n", total);
}

static void host_terms(void) {
    int kind;
    FOR_INTEGRATORS(kind) {
        int n = fail_each(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, WITH_ALL, 1, run_step);
        CHECK(n > 5 && n < MOST_CALLS);
    }
}

static void statics_and_queries(void) {
    int n = fail_each(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER,
                      WITH_PINS | WITH_ATTACH, 0, run_static);
    CHECK(n > 5 && n < MOST_CALLS);
    n = fail_each(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, WITH_ALL, 0,
                  run_energy);
    CHECK(n > 5 && n < MOST_CALLS);
    n = fail_each(CLOTH_MEMBRANE_STVK, CLOTH_BEND_QUADRATIC, CLOTH_INTEGRATOR_BDF2, WITH_ALL, 0,
                  run_potential);
    CHECK(n > 5 && n < MOST_CALLS);
}

static void restore(void) {
    static unsigned char buf[1 << 16];
    int kind, n;
    FOR_INTEGRATORS(kind) {
        cloth_status status = CLOTH_ERR_MEMORY;
        uint64_t     saved;
        size_t       size;
        fresh(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, WITH_ALL);
        CHECK(cloth_step(S.sim, 0.004, NULL) == CLOTH_OK);
        saved = cloth_sim_hash(S.sim);
        size = cloth_sim_save_size(S.sim);
        CHECK(size <= sizeof buf && cloth_sim_save(S.sim, buf, size) == CLOTH_OK);
        for (n = 1; n < MOST_CALLS && status; n++) {
            cloth_sim *other = NULL;
            uint64_t   before;
            CHECK(cloth_sim_create(S.model, &other) == CLOTH_OK);
            before = cloth_sim_hash(other);
            fail_in(n);
            status = cloth_sim_restore(other, buf, size);
            fail_never();
            CHECK(status == CLOTH_OK || status == CLOTH_ERR_MEMORY);
            CHECK(cloth_sim_hash(other) == (status ? before : saved));
            CHECK(cloth_sim_restore(other, buf, size) == CLOTH_OK);
            CHECK(cloth_sim_hash(other) == saved);
            CHECK(cloth_step(other, 0.004, NULL) == CLOTH_OK);
            cloth_sim_destroy(other);
        }
        CHECK(n < MOST_CALLS);
        done();
    }
}

/* Calls that allocate at first use only. */
static void control(void) {
    double        f[200] = {0};
    host_rope     rope;
    cloth_params *p;
    uint64_t      before;
    int           n;
    fresh(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, 0);
    before = cloth_sim_hash(S.sim);
    fail_in(1);
    CHECK(cloth_sim_set_force(S.sim, f) == CLOTH_ERR_MEMORY && cloth_sim_hash(S.sim) == before);
    for (n = 1, p = NULL; n < MOST_CALLS && !p; n++) {
        fail_in(n);
        p = cloth_sim_params(S.sim);
    }
    fail_never();
    CHECK(n > 3 && n < MOST_CALLS && p && cloth_sim_hash(S.sim) == before);
    CHECK(cloth_sim_set_force(S.sim, f) == CLOTH_OK);
    CHECK(cloth_sim_params_changed(S.sim) == CLOTH_OK);
    add_rope(&rope);
    before = cloth_sim_hash(S.sim);
    fail_in(1);
    CHECK(cloth_sim_hash(S.sim) == 0);      /* no memory for the rope's state: says so */
    fail_never();
    CHECK(cloth_sim_hash(S.sim) == before && before != 0);
    done();
}

/* bytes.total is what the allocator has given out, byte for byte. */
static void total_bytes(void) {
    int kind, m, b, with;
    FOR_INTEGRATORS(kind)
        for (m = CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++)
            for (b = CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++)
                for (with = 0; with < 2; with++) {
                    cloth_report r;
                    fresh(m, b, kind, with ? WITH_ALL : 0);
                    CHECK(!with || cloth_sim_params(S.sim) != NULL);
                    CHECK(cloth_step(S.sim, 0.004, &r) == CLOTH_OK && r.bytes.total == told.bytes);
                    CHECK(cloth_step(S.sim, 0.004, &r) == CLOTH_OK && r.bytes.total == told.bytes);
                    done();
                }
}

static void advise(void) {
    cloth_advice a;
    int          n;
    cloth_status status = CLOTH_ERR_MEMORY;
    hooks = host_hooks(&told);
    scene_desc(&S, 4, &hooks, 0);
    for (n = 1; n < MOST_CALLS && status; n++) {
        fail_in(n);
        status = cloth_advise(&S.desc, 0.01, 1e-3, &a);
        fail_never();
        CHECK((status == CLOTH_OK || status == CLOTH_ERR_MEMORY) && told.live == 0);
    }
    CHECK(n > 1 && n < MOST_CALLS);
    done();
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(model_create);
    RUN(sim_create);
    RUN(first_step);
    RUN(host_terms);
    RUN(statics_and_queries);
    RUN(restore);
    RUN(control);
    RUN(total_bytes);
    RUN(advise);
    return TEST_END();
}
