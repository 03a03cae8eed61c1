/* test_determinism.c - the same bits for 1 to 16 workers, forward, reversed and shuffled ranges
 * of odd sizes, and real threads: every integrator, every rung. Golden numbers are integers only.
 *   cc -std=c99 -O2 -ffp-contract=off -pthread -DCLOTHSIM_IMPLEMENTATION -I.. test_determinism.c \
 *      -o test_determinism -lm && ./test_determinism */
#include "clothsim.h"
#include "test.h"
#include "scene.h"
#include "threads.h"

/* --- fake hooks: one thread that plays many workers --- */

typedef enum order { FORWARD, REVERSED, SHUFFLED, ONE_BY_ONE, WHOLE } order;

typedef struct player {
    order     how;
    int       workers;
    long long ranges;
} player;

/* Range sizes 1, 3, 5, ... times the grain where asked; each worker in turn. */
static void play(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    player *p = (player *)user;
    int     begin[4096], end[4096], n = 0, at = 0, i, j;
    while (at < count && n < 4095) {
        int size = p->how == ONE_BY_ONE ? 1 : p->how == WHOLE ? count
                 : p->how == SHUFFLED ? grain * (1 + 2 * (n % 3)) : grain;
        begin[n] = at;
        end[n] = at = count - at < size ? count : at + size;
        n++;
    }
    if (at < count) {
        begin[n] = at;
        end[n++] = count;
    }
    for (i = n - 1; p->how == SHUFFLED && i > 0; i--) {
        int b, e;
        j = (int)((noise((unsigned)(i + n)) + 1) * 0.5 * (i + 1));
        b = begin[i]; e = end[i];
        begin[i] = begin[j]; end[i] = end[j];
        begin[j] = b; end[j] = e;
    }
    for (i = 0; i < n; i++) {
        j = p->how == REVERSED ? n - 1 - i : i;
        fn(begin[j], end[j], i % p->workers, ctx);
    }
    p->ranges += n;
}

/* --- a real one --- */

static void play_threads(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    player *p = (player *)user;
    threads_run(&p->workers, count, grain, fn, ctx);
    p->ranges += p->workers;
}

/* --- runs --- */

static int N, STEPS;

static uint64_t run(int membrane, int bend, int integrator, int linear,
                    void (*how)(void *, int, int, cloth_range_fn *, void *), player *p) {
    cloth_hooks hooks;
    scene       s;
    uint64_t    hash;
    int         k;
    memset(&hooks, 0, sizeof hooks);
    if (how) {
        hooks.parallel.run = how;
        hooks.parallel.user = p;
        hooks.parallel.max_workers = p->workers;
    }
    scene_desc(&s, N, &hooks, WITH_ALL);
    s.desc.membrane = (cloth_membrane)membrane;
    s.desc.bend = (cloth_bend_model)bend;
    s.desc.integrator = (cloth_integrator)integrator;
    s.desc.linear = (cloth_linear)linear;
    s.desc.tolerance = 1e-4;
    if (scene_open(&s, WITH_ALL)) return 0;
    for (k = 0; k < STEPS; k++) {
        cloth_status status = cloth_step(s.sim, 0.004, NULL);
        if (status == CLOTH_ERR_UNSUPPORTED && k == 0) {
            printf("  solver %d: %s\n", linear, cloth_status_text(status));
            break;
        }
        CHECK(status == CLOTH_OK);
        if (status) break;
    }
    hash = cloth_sim_hash(s.sim);
    scene_close(&s);
    return hash;
}

static const struct { order how; int workers; } game[] = {
    {FORWARD, 1}, {FORWARD, 2}, {REVERSED, 3}, {SHUFFLED, 7}, {ONE_BY_ONE, 16}, {WHOLE, 1},
    {REVERSED, 16}, {SHUFFLED, 16}};

/* Everything between serial and sixteen workers, in the default rung. */
static void every_order(void) {
    int kind;
    size_t g;
    N = 14;
    STEPS = 20;
    FOR_INTEGRATORS(kind) {
        const uint64_t serial = run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind,
                                    CLOTH_LINEAR_AUTO, NULL, NULL);
        for (g = 0; g < sizeof game / sizeof *game; g++) {
            player p;
            memset(&p, 0, sizeof p);
            p.how = game[g].how;
            p.workers = game[g].workers;
            CHECK(run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, CLOTH_LINEAR_AUTO, play, &p) ==
                  serial);
            CHECK(p.ranges > 0);
        }
    }
}

/* Larger, so that every loop has several chunks; few steps. */
static void many_chunks(void) {
    player p;
    int    kind;
    N = 36;
    STEPS = 2;
    FOR_INTEGRATORS(kind) {
        const uint64_t serial = run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind,
                                    CLOTH_LINEAR_AUTO, NULL, NULL);
        memset(&p, 0, sizeof p);
        p.how = SHUFFLED;
        p.workers = 5;
        CHECK(run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, CLOTH_LINEAR_AUTO, play, &p) ==
              serial);
        CHECK(p.ranges > 100);
    }
}

static void every_rung(void) {
    int kind, m, b;
    N = 9;
    STEPS = 20;
    FOR_INTEGRATORS(kind)
        for (m = CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++)
            for (b = CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++) {
                player   p;
                uint64_t serial = run(m, b, kind, CLOTH_LINEAR_AUTO, NULL, NULL);
                memset(&p, 0, sizeof p);
                p.how = SHUFFLED;
                p.workers = 6;
                CHECK(run(m, b, kind, CLOTH_LINEAR_AUTO, play, &p) == serial);
                p.how = REVERSED;
                CHECK(run(m, b, kind, CLOTH_LINEAR_AUTO, play, &p) == serial);
            }
}

static void every_solver(void) {
    int linear;
    N = 12;
    STEPS = 6;
    for (linear = CLOTH_LINEAR_AUTO; linear <= (int)CLOTH_LINEAR_CHOLESKY; linear++) {
        player         p;
        const uint64_t serial =
            run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_BDF2, linear, NULL, NULL);
        memset(&p, 0, sizeof p);
        p.how = SHUFFLED;
        p.workers = 4;
        CHECK(run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_BDF2, linear, play,
                  &p) == serial);
        p.how = REVERSED;
        CHECK(run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_BDF2, linear, play,
                  &p) == serial);
    }
}

static void real_threads(void) {
    int kind, workers;
    N = 24;
    STEPS = 2;
    FOR_INTEGRATORS(kind) {
        const uint64_t serial = run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind,
                                    CLOTH_LINEAR_AUTO, NULL, NULL);
        for (workers = 2; workers <= 4; workers += 2) {
            player p;
            memset(&p, 0, sizeof p);
            p.workers = workers;
            CHECK(run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, CLOTH_LINEAR_AUTO,
                      play_threads, &p) == serial);
            CHECK(p.ranges > 0);
        }
    }
}

static void same_twice(void) {
    int kind;
    N = 8;
    STEPS = 10;
    FOR_INTEGRATORS(kind) {
        const uint64_t once = run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind,
                                  CLOTH_LINEAR_AUTO, NULL, NULL);
        CHECK(once != 0 && once == run(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind,
                                       CLOTH_LINEAR_AUTO, NULL, NULL));
    }
}

/* A report asked for or not, a hash taken or not, an energy read or not: the same motion. */
static void looking_changes_nothing(void) {
    int kind, k;
    FOR_INTEGRATORS(kind) {
        uint64_t     hash[2];
        cloth_report r;
        cloth_ledger l;
        double       e;
        float        pos[300];
        int          look;
        for (look = 0; look < 2; look++) {
            scene s = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE,
                                 (cloth_integrator)kind, NULL, WITH_ALL);
            for (k = 0; k < 10; k++) {
                CHECK(cloth_step(s.sim, 0.01, look ? &r : NULL) == CLOTH_OK);
                if (!look) continue;
                (void)cloth_sim_hash(s.sim);
                CHECK(cloth_sim_energy(s.sim, &l) == CLOTH_OK);
                CHECK(cloth_sim_potential(s.sim, cloth_sim_state(s.sim)->x, &e, NULL) == CLOTH_OK);
                CHECK(cloth_sim_vertices_f32(s.sim, NULL, pos, NULL, 0) == CLOTH_OK);
                CHECK(cloth_sim_params(s.sim) != NULL);
            }
            hash[look] = cloth_sim_hash(s.sim);
            scene_close(&s);
        }
        CHECK(hash[0] == hash[1]);
    }
}

/* Counts of the 5 x 5 equilateral sheet, by hand: rows of 5, 6, 5, 6, 5 vertices; 9 faces
 * between two rows; V - E + F = 1. */
static void golden_topology(void) {
    scene s = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, NULL, 0);
    const cloth_topology *t = cloth_model_topology(s.model);
    CHECK(t->nv == 27 && t->nf == 36 && t->ne == 62);
    CHECK(t->nh == 62 - 16 && t->nloop == 1 && t->loop_start[1] == 16);
    CHECK(t->edges[0] == 0 && t->edges[1] == 1);
    scene_close(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(golden_topology);
    RUN(same_twice);
    RUN(looking_changes_nothing);
    RUN(every_order);
    RUN(many_chunks);
    RUN(every_rung);
    RUN(every_solver);
    RUN(real_threads);
    return TEST_END();
}
