/* test_tape.c - the tape: the same bits under any budget, what ends it, a sim that goes first, an
 * allocator that fails, bad input; and that neither tape nor gradient moves the sim by a bit.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_tape.c -o test_tape -lm && ./test_tape */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "test.h"
#include "scene.h"
#include "grad_scene.h"
#include "grad_host.h"

static host        told;
static cloth_hooks hooks;

/* --- budgets --- */

/* The smallest budget that a tape of this play is made with. */
static size_t least_budget(const play *p) {
    size_t low = 0, high = (size_t)1 << 30;
    scene  s;
    play_open(p, &s);
    while (high - low > 8) {
        cloth_tape_options o = cloth_tape_options_default();
        cloth_tape        *tape;
        o.bytes = low + (high - low) / 2;
        if (cloth_tape_create(s.sim, &o, &tape) == CLOTH_OK) high = o.bytes;
        else low = o.bytes;
        cloth_tape_destroy(tape);
    }
    scene_close(&s);
    return high;
}

static void same_bits(play p, const char *what) {
    results           all;
    cloth_grad_report rep;
    cloth_tape       *tape = NULL;
    scene             s;
    size_t            least, whole;
    int               i;
    hooks = host_hooks(&told);
    p.hooks = &hooks;
    (void)play_run(&p, &s, &tape, -1);
    all = results_make(&s, p.steps);
    backward(tape, &s, &all, &rep);
    whole = rep.bytes;
    CHECK(rep.replayed == (p.integrator == CLOTH_INTEGRATOR_LEAPFROG ? p.steps : 0));
    cloth_tape_destroy(tape);
    scene_close(&s);
    least = least_budget(&p);
    for (i = 0; i < 6; i++) {
        results r;
        int     by;
        p.bytes = least + (size_t)(i < 5 ? i * i : 25) * (whole > least ? (whole - least) / 25 : 0);
        if (p.integrator == CLOTH_INTEGRATOR_LEAPFROG) p.bytes += least / 2;    /* its path */
        (void)play_run(&p, &s, &tape, -1);
        if (cloth_tape_steps(tape) < p.steps) {         /* its inputs alone are too many */
            CHECK(i < 4 && strstr(cloth_tape_ended(tape), "options.bytes") != NULL);
            cloth_tape_destroy(tape);
            scene_close(&s);
            continue;
        }
        r = results_make(&s, p.steps);
        backward(tape, &s, &r, &rep);
        CHECK(rep.bytes <= p.bytes);
        if (test_full() || i == 2)
            printf("  %s: %zu of %zu bytes, %zu asked, %d steps replayed\n", what, rep.bytes, whole,
                   p.bytes, rep.replayed);
        for (by = 0; by < BY_COUNT; by++)
            CHECK(memcmp(r.array[by], all.array[by], (size_t)r.n[by] * sizeof(double)) == 0);
        results_free(&r);
        cloth_tape_destroy(tape);
        scene_close(&s);
        CHECK(told.live == 0);
    }
    results_free(&all);
}

static void tape_budget(void) {
    play p = play_default();
    p.steps = 40;
    p.tolerance = 1e-9;
    p.still = 1;
    same_bits(p, "euler");
    p.integrator = CLOTH_INTEGRATOR_BDF2;
    same_bits(p, "bdf2");
    p.substeps = 3;
    p.still = 0;
    p.steps = GRAD_STEPS;
    same_bits(p, "bdf2, 3 substeps, input that moves");
    p.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    p.substeps = 0;
    same_bits(p, "leapfrog");
}

/* Steps that a tape of so many bytes records; -1: it is refused. */
static int steps_in(const play *p, size_t bytes) {
    cloth_tape_options o = cloth_tape_options_default();
    cloth_tape        *tape = NULL;
    scene              s;
    int                k, n = -1;
    o.bytes = bytes;
    play_open(p, &s);
    if (cloth_tape_create(s.sim, &o, &tape) == CLOTH_OK) {
        for (k = 0; k < p->steps; k++) CHECK(cloth_step(s.sim, p->h, NULL) == CLOTH_OK);
        n = cloth_tape_steps(tape);
        CHECK((cloth_tape_ended(tape) != NULL) == (n < p->steps));
    }
    cloth_tape_destroy(tape);
    scene_close(&s);
    return n;
}

/* Slots go before a tape ends: where one budget is enough, more is. */
static void more_is_enough(void) {
    play         p = play_default();
    const size_t step = 56;                 /* less than what a block takes beside its content */
    size_t       bytes, least;
    int          whole = 0, early = 0, n;
    p.n = 4, p.steps = 24, p.tolerance = 1e-4, p.with = WITH_PINS;
    least = least_budget(&p);
    for (bytes = least; bytes < least + 14000; bytes += step) {
        n = steps_in(&p, bytes);
        early += whole && n < p.steps;
        whole |= n == p.steps;
    }
    if (!CHECK(whole && early == 0)) printf("  %d budgets end early\n", early);
}

/* What is taken as enough for a step records one; LEAPFROG's path of desc.substeps is in it. */
static void enough_for_one(void) {
    play p = play_default();
    p.steps = 3, p.integrator = CLOTH_INTEGRATOR_LEAPFROG, p.substeps = 200;
    CHECK(steps_in(&p, least_budget(&p)) > 0);
    p.integrator = CLOTH_INTEGRATOR_BDF2, p.substeps = 3, p.tolerance = 1e-4;
    CHECK(steps_in(&p, least_budget(&p)) > 0);
}

typedef struct hurry {
    int calls, always;
} hurry;

static int in_a_hurry(void *user) {
    hurry *u = (hurry *)user;
    return ++u->calls % 50 == 0 || u->always ? 2 : 0;
}

/* The host's time is up in some steps, and all the while that they are run anew. */
static void out_of_time(void) {
    cloth_grad_report rep;
    results           r[2];
    int               i, by;
    rep.bytes = 0;
    for (i = 0; i < 2; i++) {
        play        p = play_default();
        cloth_tape *tape = NULL;
        scene       s;
        hurry       user = {0, 0};
        p.tolerance = 1e-6, p.steps = GRAD_STEPS, p.bytes = rep.bytes * 19 / 20 * (size_t)i;
        p.substeps = 2;
        hooks = host_hooks(&told);
        hooks.cancel.fn = in_a_hurry, hooks.cancel.user = &user;
        p.hooks = &hooks;
        (void)play_run(&p, &s, &tape, -1);
        CHECK(cloth_tape_steps(tape) == p.steps);
        r[i] = results_make(&s, p.steps);
        user.always = 1;
        backward(tape, &s, r + i, &rep);
        CHECK((rep.replayed > 0) == i && (!i || rep.bytes <= p.bytes));
        cloth_tape_destroy(tape);
        scene_close(&s);
    }
    for (by = 0; by < BY_COUNT; by++)
        CHECK(memcmp(r[0].array[by], r[1].array[by], (size_t)r[0].n[by] * sizeof(double)) == 0);
    results_free(r), results_free(r + 1);
}

/* LEAPFROG's path grows in a walk backwards where earlier steps had more kicks; not beyond the
 * budget, of which it would take twice its length at once. */
static void longer_paths(void) {
    int trial, k, whole = 0;
    for (trial = 0; trial < 8; trial++) {
        cloth_tape_options o = cloth_tape_options_default();
        play               p = play_default();
        cloth_tape        *tape = NULL;
        cloth_grad_report  rep;
        results            r;
        scene              s;
        size_t             most;
        p.n = 6, p.integrator = CLOTH_INTEGRATOR_LEAPFROG;
        play_open(&p, &s);
        r = results_make(&s, 8);
        o.bytes = (size_t)(200000 + 100000 * trial);
        if (cloth_tape_create(s.sim, &o, &tape) == CLOTH_OK) {
            for (k = 0; k < 8; k++) CHECK(!cloth_step(s.sim, 0.03 - 0.0035 * k, NULL));
            whole += cloth_tape_steps(tape) == 8;
            if (cloth_tape_steps(tape) > 0) backward(tape, &s, &r, &rep);
            (void)cloth_tape_bytes(tape, &most);
            if (test_full()) printf("  %zu of %zu bytes\n", most, o.bytes);
            CHECK(most <= o.bytes);
        }
        results_free(&r);
        cloth_tape_destroy(tape);
        scene_close(&s);
    }
    CHECK(whole > 2);
}

/* --- the sim does not notice --- */

static void sim_untouched(void) {
    int kind;
    FOR_INTEGRATORS(kind) {
        play              p = play_default();
        cloth_tape       *tape = NULL;
        cloth_grad_report rep;
        results           r;
        scene             s, other;
        uint64_t          before;
        p.integrator = (cloth_integrator)kind;
        p.tolerance = 1e-6;
        p.bytes = 400000;
        (void)play_run(&p, &s, &tape, -1);
        (void)play_run(&p, &other, NULL, -1);
        before = cloth_sim_hash(s.sim);
        CHECK(before == cloth_sim_hash(other.sim));
        r = results_make(&s, p.steps);
        cloth_sim_params(s.sim)->material[0].density = 0.77;    /* the host's, not accepted yet */
        backward(tape, &s, &r, &rep);
        CHECK(cloth_sim_hash(s.sim) == before);
        CHECK_NEAR(cloth_sim_params(s.sim)->material[0].density, 0.77, 0);
        CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
        CHECK(cloth_step(other.sim, p.h, NULL) == CLOTH_OK);
        CHECK(cloth_sim_hash(s.sim) == cloth_sim_hash(other.sim));
        CHECK(cloth_tape_steps(tape) == p.steps + 1);
        results_free(&r);
        cloth_tape_destroy(tape);
        scene_close(&s);
        scene_close(&other);
    }
}

/* A loss reads the host's copy of the parameters, by a pointer from before and by asking again. */
static void masses_loss(int k, const double *x, const double *v, double *g_x, double *g_v,
                        void *user) {
    scene              *s = (scene *)user;
    const cloth_params *p = cloth_sim_params(s->sim);
    int                 i;
    (void)k, (void)v, (void)g_v;
    CHECK(p->material[0].density == 0.77);
    for (i = 0; i < 3 * s->nv; i++) g_x[i] += p->mass[i / 3] * x[i];
}

static void params_in_a_loss(void) {
    play                p = play_default();
    cloth_tape         *tape = NULL;
    cloth_grad_report   rep;
    results             r;
    scene               s;
    const cloth_params *before;
    const double       *mass;
    (void)play_run(&p, &s, &tape, -1);
    r = results_make(&s, p.steps);
    before = cloth_sim_params(s.sim);
    mass = before->mass;
    cloth_sim_params(s.sim)->material[0].density = 0.77;
    CHECK(cloth_grad_backward(tape, masses_loss, &s, &r.g, &rep) == CLOTH_OK);
    CHECK(before->mass == mass && before->material[0].density == 0.77);
    results_free(&r);
    cloth_tape_destroy(tape);
    scene_close(&s);
}

/* --- what ends it --- */

typedef struct held {                       /* of a record, for a replay                       */
    cloth_step_record r;
    unsigned char     state[200000];
} held;

static held Held;

static void hold(void *user, const cloth_step_record *r) {
    (void)user;
    Held.r = *r;
    if (r->bytes > sizeof Held.state) exit(2);
    memcpy(Held.state, r->state, r->bytes);
    Held.r.state = Held.state;
}

enum { END_WRITE, END_TIME, END_RESTORE, END_RESET, END_REPLAY, END_COUNT };

static void end_by(scene *s, int how, unsigned char *buf, size_t size) {
    cloth_sim *sim = s->sim;
    if (how == END_WRITE) cloth_sim_state(sim)->x[4] += 1e-9;
    if (how == END_TIME) cloth_sim_state(sim)->t += 1;
    if (how == END_RESTORE) CHECK(cloth_sim_restore(sim, buf, size) == CLOTH_OK);
    if (how == END_RESET) CHECK(cloth_sim_reset(sim) == CLOTH_OK);
    if (how == END_REPLAY) CHECK(cloth_step_replay(sim, &Held.r, NULL) == CLOTH_OK);
}

static void tape_ends(void) {
    static unsigned char buf[200000];
    int                  how;
    for (how = 0; how < END_COUNT; how++) {
        play              p = play_default();
        cloth_recorder    listen;
        cloth_tape       *tape = NULL;
        cloth_grad_report rep;
        results           r;
        scene             s;
        size_t            size;
        int               k;
        p.tolerance = 1e-6;
        p.steps = 0;
        hooks = host_hooks(&told);
        p.hooks = &hooks;
        (void)play_run(&p, &s, &tape, -1);
        memset(&listen, 0, sizeof listen);
        listen.step = hold;
        CHECK(cloth_sim_set_recorder(s.sim, &listen) == CLOTH_OK);  /* besides the tape */
        for (k = 0; k < 6; k++) {
            CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
            size = cloth_sim_save_size(s.sim);
            if (k == 2) CHECK(size < sizeof buf && cloth_sim_save(s.sim, buf, size) == CLOTH_OK);
        }
        CHECK(cloth_tape_steps(tape) == 6 && !cloth_tape_ended(tape));
        cloth_sim_state_changed(s.sim);     /* drops history, writes nothing */
        CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK && cloth_tape_steps(tape) == 7);
        host_forget(&told);
        end_by(&s, how, buf, sizeof buf);
        CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
        CHECK(cloth_tape_steps(tape) == 7 && cloth_tape_ended(tape) != NULL);
        CHECK(strstr(told.text, "the state was moved") != NULL);
        r = results_make(&s, 7);
        backward(tape, &s, &r, &rep);       /* what was recorded stays good */
        CHECK(rep.steps == 7 && rep.valid);
        results_free(&r);
        cloth_tape_destroy(tape);
        scene_close(&s);
        CHECK(told.live == 0);
    }
}

static void tape_orphan(void) {
    play        p = play_default();
    cloth_tape *tape = NULL;
    cloth_grad  g;
    loss_user   u;
    scene       s;
    p.tolerance = 1e-6;
    hooks = host_hooks(&told);
    p.hooks = &hooks;
    (void)play_run(&p, &s, &tape, -1);
    scene_close(&s);
    memset(&g, 0, sizeof g);
    memset(&u, 0, sizeof u);
    CHECK(cloth_tape_steps(tape) == p.steps);
    CHECK(cloth_grad_backward(tape, loss_at, &u, &g, NULL) == CLOTH_ERR_HANDLE);
    CHECK(strstr(cloth_tape_ended(tape), "destroyed") != NULL);
    cloth_tape_destroy(tape);
    CHECK(told.live == 0);
}

/* --- memory --- */

static void tape_memory(void) {
    int kind, n;
    FOR_INTEGRATORS(kind)
        for (n = 1; n < 400; n++) {
            play              p = play_default();
            cloth_tape_options o = cloth_tape_options_default();
            cloth_tape       *tape = NULL;
            cloth_status      status, back = CLOTH_ERR_MEMORY;
            results           r;
            loss_user         u;
            scene             s;
            uint64_t          hash;
            int               k, good = 0;
            p.integrator = (cloth_integrator)kind;
            p.tolerance = 1e-6;
            p.n = 4;
            hooks = host_hooks(&told);
            p.hooks = &hooks;
            play_open(&p, &s);
            CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
            r = results_make(&s, 5);
            memset(&u, 0, sizeof u);
            u.nv = s.nv;
            u.only = -1;
            host_forget(&told);
            told.fail_at = told.calls + n;
            status = cloth_tape_create(s.sim, &o, &tape);
            CHECK(status == CLOTH_OK || (status == CLOTH_ERR_MEMORY && !tape));
            for (k = 0; k < 5; k++) good += cloth_step(s.sim, p.h, NULL) == CLOTH_OK;
            hash = cloth_sim_hash(s.sim);
            if (tape && cloth_tape_steps(tape) == 5)
                back = cloth_grad_backward(tape, loss_at, &u, &r.g, NULL);
            CHECK(back == CLOTH_OK || back == CLOTH_ERR_MEMORY);
            if (back && tape && cloth_tape_steps(tape) == 5)
                CHECK(!(fabs(r.g.x0[0]) > 0) && !(fabs(r.g.gravity[1]) > 0));
            CHECK(good == 5 && cloth_sim_hash(s.sim) == hash);
            told.fail_at = 0;
            if (tape) {
                CHECK(!cloth_tape_ended(tape) == (cloth_tape_steps(tape) == 5));
                CHECK(!cloth_tape_steps(tape) ||
                      cloth_grad_backward(tape, loss_at, &u, &r.g, NULL) == CLOTH_OK);
            }
            results_free(&r);
            cloth_tape_destroy(tape);
            scene_close(&s);
            CHECK(told.live == 0);
            if (back == CLOTH_OK) break;
        }
    CHECK(n > 8 && n < 400);
}

/* --- bad input --- */

static void nan_loss(int k, const double *x, const double *v, double *gx, double *gv, void *user) {
    (void)x, (void)v, (void)gv, (void)user;
    gx[0] = 1;
    if (k == 3) gx[7] = NAN;
}

static void bad_options(scene *s) {
    cloth_tape_options o = cloth_tape_options_default();
    cloth_tape        *tape, *second;
    o.cookie = 0;
    CHECK(cloth_tape_create(s->sim, &o, &tape) == CLOTH_ERR_UNINIT && !tape);
    o = cloth_tape_options_default();
    o.tolerance = NAN;
    CHECK(cloth_tape_create(s->sim, &o, &tape) == CLOTH_ERR_NONFINITE);
    o.tolerance = 0;
    CHECK(cloth_tape_create(s->sim, &o, &tape) == CLOTH_ERR_ARGUMENT);
    o.tolerance = 1e-9, o.linear = (cloth_linear)9;
    CHECK(cloth_tape_create(s->sim, &o, &tape) == CLOTH_ERR_ARGUMENT && !tape);
    CHECK(strstr(told.text, "linear = 9") != NULL);
    o = cloth_tape_options_default();
    o.bytes = 1000;
    CHECK(cloth_tape_create(s->sim, &o, &tape) == CLOTH_ERR_CAPACITY && !tape);
    CHECK(strstr(told.text, "options.bytes = 1000 but one step takes") != NULL);
    CHECK(cloth_tape_create(s->sim, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_tape_create(NULL, NULL, &tape) == CLOTH_ERR_ARGUMENT && !tape);
    CHECK(cloth_tape_create(s->sim, NULL, &tape) == CLOTH_OK);
    CHECK(cloth_tape_create(s->sim, NULL, &second) == CLOTH_ERR_ARGUMENT && !second);
    cloth_tape_destroy(tape);
    cloth_tape_destroy(NULL);
    CHECK(cloth_tape_steps(NULL) == 0 && cloth_tape_bytes(NULL, NULL) == 0);
}

/* A sim without a tape pays nothing: where one was made, recorded and went, bytes, blocks and bits
 * are those of a sim that never had one, and steps allocate nothing. (Instructions: bench_grad.) */
static void nothing_without(void) {
    static host       never;
    const cloth_hooks without = host_hooks(&never);
    int               kind, k, calls[2];
    FOR_INTEGRATORS(kind) {
        play        p = play_default();
        cloth_tape *tape = NULL;
        scene       s, other;
        p.integrator = (cloth_integrator)kind;
        p.tolerance = 1e-6;
        hooks = host_hooks(&told);
        p.hooks = &hooks;
        (void)play_run(&p, &s, &tape, -1);
        CHECK(cloth_tape_steps(tape) == p.steps);
        cloth_tape_destroy(tape);
        p.hooks = &without;
        (void)play_run(&p, &other, NULL, -1);
        CHECK(told.bytes == never.bytes && told.live == never.live && told.bytes > 0);
        calls[0] = told.calls, calls[1] = never.calls;
        for (k = 0; k < 3; k++) {
            CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
            CHECK(cloth_step(other.sim, p.h, NULL) == CLOTH_OK);
        }
        CHECK(told.calls == calls[0] && never.calls == calls[1]);
        CHECK(cloth_sim_hash(s.sim) == cloth_sim_hash(other.sim));
        scene_close(&s);
        scene_close(&other);
        CHECK(told.bytes == 0 && never.bytes == 0);
    }
}

static void tape_bad_input(void) {
    play              p = play_default();
    cloth_tape       *tape = NULL;
    cloth_grad_report rep;
    cloth_grad        g;
    double            friction = 0;
    results           r;
    loss_user         u;
    scene             s;
    int               i;
    p.tolerance = 1e-6;
    p.steps = 0;
    hooks = host_hooks(&told);
    p.hooks = &hooks;
    (void)play_run(&p, &s, &tape, -1);
    memset(&u, 0, sizeof u);
    memset(&g, 0, sizeof g);
    u.nv = s.nv;
    CHECK(cloth_grad_backward(tape, loss_at, &u, &g, &rep) == CLOTH_ERR_ARGUMENT);  /* no step */
    CHECK(rep.status == CLOTH_ERR_ARGUMENT && !rep.valid);
    for (i = 0; i < 6; i++) CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
    CHECK(cloth_grad_backward(NULL, loss_at, &u, &g, &rep) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_grad_backward(tape, NULL, &u, &g, &rep) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_grad_backward(tape, loss_at, &u, NULL, &rep) == CLOTH_ERR_ARGUMENT);
    CHECK(rep.status == CLOTH_ERR_ARGUMENT && !rep.valid && rep.step < 0);
    g.friction = &friction;
    CHECK(cloth_grad_backward(tape, loss_at, &u, &g, &rep) == CLOTH_ERR_UNSUPPORTED);
    r = results_make(&s, 6);
    r.g.x0[0] = r.g.mass[0] = 1;            /* refused, arrays are zero too */
    CHECK(cloth_grad_backward(tape, NULL, &u, &r.g, &rep) == CLOTH_ERR_ARGUMENT);
    CHECK(!(fabs(r.g.x0[0]) > 0 || fabs(r.g.mass[0]) > 0));
    CHECK(cloth_grad_backward(tape, nan_loss, &u, &r.g, &rep) == CLOTH_ERR_NONFINITE);
    CHECK(strstr(told.text, "k = 3, vertex 2") != NULL && !rep.valid);
    CHECK(!(fabs(r.g.x0[0]) > 0) && !(fabs(r.g.gravity[0]) > 0));
    cloth_tape_destroy(tape);
    bad_options(&s);
    results_free(&r);
    scene_close(&s);
    CHECK(told.live == 0);
}

/* Contact has no vjp yet: refused by name, whatever else is right. */
static void contact_refused(void) {
    play           p = play_default();
    cloth_collide *c = NULL;
    cloth_tape    *tape = NULL;
    cloth_grad     g;
    loss_user      u;
    scene          s;
    hooks = host_hooks(&told);
    p.hooks = &hooks;
    p.tolerance = 1e-4;
    p.with = WITH_PINS;
    play_desc(&p, &s);
    s.desc.contact = CLOTH_CONTACT_OBSTACLES;
    CHECK(scene_open(&s, p.with) == CLOTH_OK);
    CHECK(cloth_collide_create(s.sim, NULL, &c) == CLOTH_OK);
    CHECK(cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
    CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK && cloth_tape_steps(tape) == 1);
    memset(&g, 0, sizeof g);
    memset(&u, 0, sizeof u);
    u.nv = s.nv;
    s.sim->contact.vjp = NULL;              /* a host's own contact */
    CHECK(cloth_grad_backward(tape, loss_at, &u, &g, NULL) == CLOTH_ERR_UNSUPPORTED);
    CHECK(strstr(told.text, "contact of this sim has no vjp") != NULL);
    cloth_tape_destroy(tape);
    cloth_collide_destroy(c);
    scene_close(&s);
    CHECK(told.live == 0);
}

/* A host's term that comes ends a tape, which says so; its steps knew of none. */
static void term_added(void) {
    play        p = play_default();
    swarm       pull = {1, {0, 0, 0}, 0};
    cloth_term  term = swarm_term(&pull);
    cloth_tape *tape = NULL;
    results     r;
    loss_user   u;
    scene       s;
    hooks = host_hooks(&told);
    p.hooks = &hooks, p.tolerance = 1e-6, p.steps = 3;
    (void)play_run(&p, &s, &tape, -1);
    CHECK(cloth_sim_add_term(s.sim, &term) == CLOTH_OK);
    CHECK(cloth_tape_ended(tape) && strstr(cloth_tape_ended(tape), "a term"));
    CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK && cloth_tape_steps(tape) == 3);
    r = results_make(&s, 4);
    memset(&u, 0, sizeof u);
    u.nv = s.nv, u.only = -1;
    CHECK(cloth_grad_backward(tape, loss_at, &u, &r.g, NULL) == CLOTH_ERR_FORMAT);
    if (!CHECK(strstr(told.text, "cloth_grad_backward: the snapshot has"))) puts(told.text);
    results_free(&r);
    cloth_tape_destroy(tape);
    scene_close(&s);
}

static int three_substeps(void *user) {
    (void)user;
    return 3;
}

/* A tape from before contact has room for the substeps that contact asks for. (It read and wrote
 * beside its memory.) */
static void before_contact(void) {
    static double v0[2][3 * 40];
    int           late, k;
    for (late = 0; late < 2; late++) {
        play           p = play_default();
        cloth_collide *c = NULL;
        cloth_tape    *tape = NULL;
        cloth_grad     g;
        loss_user      u;
        scene          s;
        p.with = WITH_PINS;
        play_desc(&p, &s);
        s.desc.contact = CLOTH_CONTACT_OBSTACLES;
        CHECK(scene_open(&s, p.with) == CLOTH_OK);
        CHECK(late || cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
        CHECK(cloth_collide_create(s.sim, NULL, &c) == CLOTH_OK);
        CHECK(!late || cloth_tape_create(s.sim, NULL, &tape) == CLOTH_OK);
        s.sim->contact.substeps = three_substeps;
        for (k = 0; k < 4; k++) CHECK(cloth_step(s.sim, p.h, NULL) == CLOTH_OK);
        memset(&g, 0, sizeof g);
        memset(&u, 0, sizeof u);
        u.nv = s.nv, u.only = -1;
        g.v0 = v0[late];
        CHECK(cloth_grad_backward(tape, loss_at, &u, &g, NULL) == CLOTH_OK);
        cloth_tape_destroy(tape);
        cloth_collide_destroy(c);
        scene_close(&s);
    }
    CHECK(memcmp(v0[0], v0[1], sizeof v0[0]) == 0 && fabs(v0[0][3]) > 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(tape_budget);
    RUN(more_is_enough);
    RUN(enough_for_one);
    RUN(out_of_time);
    RUN(longer_paths);
    RUN(sim_untouched);
    RUN(params_in_a_loss);
    RUN(tape_ends);
    RUN(tape_orphan);
    RUN(tape_memory);
    RUN(nothing_without);
    RUN(tape_bad_input);
    RUN(contact_refused);
    RUN(term_added);
    RUN(before_contact);
    return TEST_END();
}
