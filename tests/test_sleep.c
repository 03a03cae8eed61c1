/* test_sleep.c - desc.sleep: who falls asleep and who never does, what wakes, what a sleeping sim
 * answers, and the same bits after a restore and in replay, with the timer running or asleep.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_sleep.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "host.h"

#define H     (1.0 / 60)
#define SLEEP 0.3                           /* s: STEPS steps                                  */
#define STEPS 18
#define MOST  (3 * 2 * 81)

enum { HANG, PLANE, BALL };                 /* pinned; on a plane; two over a ball on a plane  */

typedef struct scene {
    cloth_desc     desc;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle plane, far;              /* far: a ball 1 m away                            */
    cloth_mesh    *mesh, *one[2];
    cloth_pin      pin[2];
    cloth_attachment spring;
    host            *heard;
} scene;

static void build(scene *s, int kind, cloth_integrator integrator, double sleep) {
    const double origin[3] = {0, 0, 0}, ball[3] = {0.1, 0, 0.1}, away[3] = {1, 0.1, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    int                 i, k;
    memset(s, 0, sizeof *s);
    s->heard = (host *)malloc(sizeof *s->heard);
    s->desc = cloth_desc_default();
    for (k = 0; k < 2; k++) {
        CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 9, 9, 0.2, 0.2, s->one + k));
        for (i = 0; i < 81; i++)
            s->one[k]->x[3 * i + 1] = kind == PLANE ? 0.02 : 0.11 + 0.02 * k;
    }
    CHECK(!cloth_mesh_merge(NULL, s->one, kind == BALL ? 2 : 1, &s->mesh));
    for (k = 0; k < 2; k++) s->pin[k].vertex = 8 * k, s->pin[k].axes = CLOTH_AXIS_ALL;
    s->desc.hooks = host_hooks(s->heard);
    s->desc.nv = s->mesh->nv, s->desc.x_rest = s->mesh->x, s->desc.X = s->mesh->X;
    s->desc.nf = s->mesh->nf, s->desc.faces = s->mesh->faces, s->desc.part = s->mesh->part;
    s->desc.npins = kind == HANG ? 2 : 0, s->desc.pins = s->pin;
    s->desc.material.membrane = 100;
    s->desc.material.damping = integrator == CLOTH_INTEGRATOR_LEAPFROG ? 1e-3 : 0.02;
    s->desc.integrator = integrator;
    s->desc.sleep = sleep;
    s->desc.contact = kind == HANG ? CLOTH_CONTACT_NONE : kind == PLANE ? CLOTH_CONTACT_OBSTACLES
                                                                       : CLOTH_CONTACT_SELF;
    if (cloth_model_create(&s->desc, &s->model) || cloth_sim_create(s->model, &s->sim)) exit(2);
    if (kind == HANG) return;
    if (cloth_collide_create(s->sim, NULL, &s->c)) exit(2);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = origin, o.normal[1] = 1;
    if (cloth_collide_add(s->c, &o, &s->plane)) exit(2);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = away, o.radius = 0.1;
    if (cloth_collide_add(s->c, &o, &s->far)) exit(2);
    o.x = ball;
    if (kind == BALL && cloth_collide_add(s->c, &o, &id)) exit(2);
}

static void raze(scene *s) {
    int k;
    cloth_collide_destroy(s->c);
    cloth_sim_destroy(s->sim);
    cloth_model_destroy(s->model);
    cloth_mesh_destroy(NULL, s->mesh);
    for (k = 0; k < 2; k++) cloth_mesh_destroy(NULL, s->one[k]);
    CHECK(s->heard->live == 0);
    free(s->heard);
}

/* Where an implicit solve finds the hanging sheet at rest. */
static void hang(scene *s) {
    scene t;
    build(&t, HANG, CLOTH_INTEGRATOR_EULER, 0);
    CHECK(!cloth_solve_static(t.sim, NULL));
    memcpy(cloth_sim_state(s->sim)->x, cloth_sim_state(t.sim)->x,
           3 * (size_t)s->mesh->nv * sizeof(double));
    cloth_sim_state_changed(s->sim);
    raze(&t);
}

/* Steps until one sleeps; returns how many it took, 0: none of `most` did. */
static int settle(scene *s, int most) {
    cloth_report r;
    int          i;
    for (i = 1; i <= most; i++) {
        if (cloth_step(s->sim, H, &r)) return 0;
        if (r.outcome == CLOTH_STEP_ASLEEP) return i;
    }
    return 0;
}

static double farthest(const double *x, const double *y, int nv) {
    double most = 0, d[3];
    int    i;
    for (i = 0; i < nv; i++) {
        clothi_sub3(x + 3 * i, y + 3 * i, d);
        most = fmax(most, sqrt(clothi_dot3(d, d)));
    }
    return most;
}

/* --- falling asleep --- */

/* Each step before is looked at: nobody falls asleep who was farther than 4 tolerances from where
 * it was when the last SLEEP seconds began, and then nothing leaps. */
static void one_falls_asleep(int kind) {
    static double past[STEPS + 1][MOST];
    scene         s;
    cloth_report  r, last;
    cloth_ledger  energy;
    const size_t  bytes = 3 * sizeof(double) * (kind == BALL ? 162u : 81u);
    double        force[3], torque[3], again[3], weight, speed = 0;
    int           i, n = 0, k, count = 0, more = 0;
    build(&s, kind, CLOTH_INTEGRATOR_EULER, SLEEP);
    memset(&last, 0, sizeof last);
    memset(past, 0, sizeof past);
    for (i = 0; i < 900; i++, last = r) {
        memcpy(past[i % (STEPS + 1)], cloth_sim_state(s.sim)->x, bytes);
        speed = clothi_max_abs(cloth_sim_state(s.sim)->v, 3 * s.desc.nv);
        if (cloth_step(s.sim, H, &r)) break;
        if (!(clothi_max_abs(cloth_sim_state(s.sim)->v, 3 * s.desc.nv) > 0)) break;
    }
    printf("  asleep after %.2f s, outcome %d; the step before: %.1e m/s, %.9f, then %.9f J\n",
           (i + 1) * H, (int)r.outcome, speed, last.energy.total, r.energy.total);
    CHECK(i > STEPS && i < 900 && r.outcome != CLOTH_STEP_ASLEEP);
    for (k = 0; k < STEPS; k++)
        CHECK(farthest(past[(i - k) % (STEPS + 1)], cloth_sim_state(s.sim)->x, s.desc.nv) <=
              8 * s.desc.tolerance);
    CHECK(speed * H <= s.desc.tolerance);
    weight = 9.81 * s.sim->total;
    CHECK_NEAR(r.energy.total, last.energy.total, 0.1 * weight * s.desc.tolerance);
    memcpy(past[0], cloth_sim_state(s.sim)->x, bytes);
    CHECK(!cloth_collide_contacts(s.c, 0, NULL, &count) && count > 0);
    CHECK(!cloth_collide_wrench(s.c, s.plane, NULL, force, torque));
    if (kind == PLANE) CHECK_REL(-force[1], weight, 0.02);
    for (n = 0; n < 20; n++) {
        const double t = cloth_sim_state(s.sim)->t;
        CHECK(!cloth_step(s.sim, H, n % 3 ? &r : NULL));
        CHECK_NEAR(cloth_sim_state(s.sim)->t, t + H, 1e-12);
        if (n % 3 == 0) continue;
        CHECK(r.outcome == CLOTH_STEP_ASLEEP && r.newton == 0 && r.linear_solves == 0);
        CHECK(r.substeps == 0 && r.counts.allocations == 0);
        CHECK(n == 1 || (r.counts.contact_calls == 0 && r.counts.triangles == 0));
        CHECK(r.contacts == count && !(r.energy.kinetic > 0) && r.energy.contact > 0);
        CHECK(!cloth_sim_energy(s.sim, &energy));
        CHECK(!memcmp(&energy.total, &r.energy.total, sizeof energy.total));
        CHECK_NEAR(r.energy.numerical_loss, 0, 1e-15);
    }
    CHECK(!memcmp(past[0], cloth_sim_state(s.sim)->x, bytes));
    CHECK(!cloth_collide_contacts(s.c, 0, NULL, &more) && more == count);
    CHECK(!cloth_collide_wrench(s.c, s.plane, NULL, again, torque));
    CHECK(!memcmp(force, again, sizeof force));
    for (n = 0; n < 2; n++) {               /* and what has grown since is counted */
        const size_t had = r.bytes.total;
        CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_ASLEEP);
        CHECK(r.bytes.total == s.heard->bytes && (r.bytes.total > had) == (n && kind == BALL));
        if (n == 0) CHECK(!cloth_collide_gap(s.c, 0.2, &speed));
    }
    raze(&s);
}

static void falls_asleep(void) {
    one_falls_asleep(PLANE);
    one_falls_asleep(BALL);
}

/* The report of a step asleep is of the step that was asked for. */
static void asleep_for_any_time(void) {
    cloth_report r;
    scene        s;
    int          k;
    build(&s, PLANE, CLOTH_INTEGRATOR_EULER, SLEEP);
    CHECK(settle(&s, 900));
    for (k = 1; k < 4; k++) {
        CHECK(!cloth_step(s.sim, k * H, &r) && r.outcome == CLOTH_STEP_ASLEEP);
        CHECK_NEAR(r.h, k * H, 0);
    }
    raze(&s);
}

/* --- what wakes and what does not --- */

static cloth_status flat_eval(void *user, const cloth_eval *e, double *energy) {
    (void)user, (void)e;
    *energy = 0;
    return CLOTH_OK;
}

static const double third[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3}, low[3] = {0, -0.1, 0.1};

static void hang_change(scene *s, int i) {
    cloth_sim     *sim = s->sim;
    cloth_material mat = s->desc.material;
    cloth_term     term;
    const double   to[3] = {0, 0.111, 0}, g[3] = {0, -9.8, 0}, wind[3] = {0, 0, 1};
    cloth_attachment id;
    double         f[MOST];
    memset(&term, 0, sizeof term);
    memset(f, 0, sizeof f);
    term.eval = flat_eval;
    f[100] = 1e-3;
    mat.bending *= 2;
    switch (i) {
    case 0: CHECK(!cloth_sim_pin(sim, 0, CLOTH_AXIS_ALL, to)); break;
    case 1: CHECK(!cloth_sim_pin(sim, 40, CLOTH_AXIS_Y, NULL)); break;
    case 2: CHECK(!cloth_sim_unpin(sim, 8)); break;
    case 3: CHECK(!cloth_sim_attach(sim, 3, third, 10, low, &id)); break;
    case 4: CHECK(!cloth_sim_stitch(sim, 3, third, 10, 90, third, &id)); break;
    case 5: CHECK(!cloth_sim_attach_move(sim, s->spring, to)); break;
    case 6: CHECK(!cloth_sim_detach(sim, s->spring)); break;
    case 7: CHECK(!cloth_sim_set_force(sim, f)); break;
    case 8: CHECK(!cloth_sim_set_gravity(sim, g)); break;
    case 9: CHECK(!cloth_sim_set_wind(sim, wind)); break;
    case 10: CHECK(!cloth_sim_set_material(sim, 0, &mat)); break;
    case 11: cloth_sim_params(sim)->mass[3] *= 2; CHECK(!cloth_sim_params_changed(sim)); break;
    case 12: cloth_sim_state(sim)->x[120] += 1e-6; break;
    case 13: cloth_sim_state(sim)->v[120] = 1e-6; break;
    case 14: cloth_sim_state_changed(sim); break;
    case 15: CHECK(!cloth_sim_add_term(sim, &term)); break;
    default: break;
    }
}

/* Nothing new. */
static void hang_same(scene *s, int i) {
    const double wind[3] = {0, 0, 0.1}, g[3] = {0, -9.81, 0};
    double       f[MOST];
    memset(f, 0, sizeof f);
    switch (i) {
    case 0: CHECK(!cloth_sim_pin(s->sim, 0, CLOTH_AXIS_ALL, s->mesh->x)); break;
    case 1: CHECK(!cloth_sim_unpin(s->sim, 40)); break;
    case 2: CHECK(!cloth_sim_attach_move(s->sim, s->spring, low)); break;
    case 3: CHECK(!cloth_sim_set_force(s->sim, f)); break;
    case 4: CHECK(!cloth_sim_set_gravity(s->sim, g)); break;
    case 5: CHECK(!cloth_sim_set_wind(s->sim, wind)); break;
    case 6: (void)cloth_sim_params(s->sim); break;
    case 7: CHECK(!cloth_sim_set_material(s->sim, 0, &s->desc.material)); break;
    default: break;
    }
}

static void plane_change(scene *s, int i) {
    const double up[3] = {0, 1e-4, 0}, near[3] = {0.1, 0.10304, 0.1}, v[3] = {0.1, 0, 0};
    const double through[3] = {-1, 0.1, 0.1};
    switch (i) {
    case 0: CHECK(!cloth_collide_move(s->c, s->plane, up)); break;
    case 1: CHECK(!cloth_collide_move(s->c, s->far, near)); break;
    case 2: CHECK(!cloth_collide_move(s->c, s->far, through)); break;
    case 3: CHECK(!cloth_collide_teleport(s->c, s->far, low)); break;
    case 4: CHECK(!cloth_collide_set_friction(s->c, s->plane, 0.2)); break;
    case 5: CHECK(!cloth_collide_set_surface(s->c, s->plane, v, NULL)); break;
    case 6: CHECK(!cloth_collide_remove(s->c, s->far)); break;
    default: break;
    }
}

static void plane_same(scene *s, int i) {
    const double at[3] = {0, 0, 0}, past[3] = {1, 0.1, 3}, above[3] = {0.1, 0.106, 0.1};
    const double in[3] = {0.1, 0, 0.1};
    double       x[3] = {1, 0.1, 0};
    int          k;
    switch (i) {
    case 0: CHECK(!cloth_collide_move(s->c, s->plane, at)); break;
    case 1: CHECK(!cloth_collide_set_friction(s->c, s->plane, 0.3)); break;
    case 2: CHECK(!cloth_collide_set_surface(s->c, s->plane, at, at)); break;
    case 3: CHECK(!cloth_collide_move(s->c, s->far, past)); break;
    case 4:                                 /* down from above, as near as it may */
        for (k = 0; k <= 10; k++) {
            x[0] = 1 - 0.09 * k, x[1] = above[1] + 0.2 * (1 - 0.1 * k), x[2] = above[2];
            CHECK(!cloth_collide_move(s->c, s->far, k < 10 ? x : above) &&
                  !cloth_step(s->sim, H, NULL));
        }
        break;
    case 5: CHECK(cloth_collide_teleport(s->c, s->far, in) == CLOTH_ERR_MESH); break;
    default: break;
    }
}

typedef void change_fn(scene *s, int i);

/* Every change of a list at the same sleeping sim: it wakes, for SLEEP seconds at least, or it
 * sleeps on with the same bits. */
static void look(int kind, cloth_integrator integrator, change_fn *change, int n, int wakes) {
    const double wind[3] = {0, 0, 0.1};
    double       f[MOST];
    cloth_report r;
    scene        s;
    void        *saved;
    size_t       size;
    int          i, k, slept;
    memset(f, 0, sizeof f);
    build(&s, kind, integrator, SLEEP);
    if (kind == HANG) {
        hang(&s);
        CHECK(!cloth_sim_set_wind(s.sim, wind) && !cloth_sim_set_force(s.sim, f));
        CHECK(!cloth_sim_attach(s.sim, 60, third, 5, low, &s.spring));
    }
    slept = settle(&s, 3000);
    CHECK(slept > STEPS);
    size = cloth_sim_save_size(s.sim);
    saved = malloc(size);
    CHECK(saved && !cloth_sim_save(s.sim, saved, size));
    for (i = 0; i < n; i++) {
        CHECK(!cloth_sim_restore(s.sim, saved, size));
        CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_ASLEEP);
        change(&s, i);
        for (k = 0; k < STEPS; k++) {
            CHECK(!cloth_step(s.sim, H, k % 2 ? NULL : &r));
            if ((r.outcome == CLOTH_STEP_ASLEEP) == !wakes) continue;
            printf("  kind %d, integrator %d, change %d, step %d: outcome %d\n", kind,
                   (int)integrator, i, k, (int)r.outcome);
            CHECK(0);
            break;
        }
    }
    free(saved);
    raze(&s);
}

static void wakes(void) {
    look(PLANE, CLOTH_INTEGRATOR_EULER, plane_change, 7, 1);
    look(HANG, CLOTH_INTEGRATOR_EULER, hang_change, 16, 1);
    if (test_quick()) return;
    look(HANG, CLOTH_INTEGRATOR_BDF2, hang_change, 16, 1);
    if (!test_full()) return;               /* 1100 steps until it sleeps */
    look(HANG, CLOTH_INTEGRATOR_LEAPFROG, hang_change, 16, 1);
}

static void sleeps_on(void) {
    look(HANG, CLOTH_INTEGRATOR_EULER, hang_same, 8, 0);
    look(HANG, CLOTH_INTEGRATOR_BDF2, hang_same, 8, 0);
    look(PLANE, CLOTH_INTEGRATOR_EULER, plane_same, 6, 0);
}

/* A slider that says the material before every step: the motion is as without, by BDF2 too. */
static void material_said_again(void) {
    cloth_report r;
    scene        s[2];
    int          i, k;
    for (i = 0; i < 2; i++) build(s + i, HANG, CLOTH_INTEGRATOR_BDF2, SLEEP);
    for (k = 0; k < 5; k++) {
        CHECK(!cloth_sim_set_material(s[0].sim, 0, &s[0].desc.material));
        for (i = 0; i < 2; i++) CHECK(!cloth_step(s[i].sim, H, &r));
        CHECK(cloth_sim_hash(s[0].sim) == cloth_sim_hash(s[1].sim));
    }
    for (i = 0; i < 2; i++) raze(s + i);
}

/* A new obstacle wakes; an attached one that moves pulls; a pinch does not sleep. */
static void obstacles_wake(void) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    const double        c[3] = {2, 0.2, 0}, half[3] = {0.1, 0.1, 0.1}, p[3] = {0, 0.01, 0};
    double              corner[24];
    cloth_report        r;
    cloth_obstacle      box;
    cloth_attachment    id;
    scene               s;
    build(&s, PLANE, CLOTH_INTEGRATOR_EULER, SLEEP);
    CHECK(settle(&s, 900));
    cloth_obstacle_box(c, half, NULL, corner);
    o.kind = CLOTH_OBSTACLE_BOX, o.x = corner;
    CHECK(!cloth_collide_add(s.c, &o, &box));
    CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_CONVERGED);
    CHECK(settle(&s, 900));
    CHECK(!cloth_collide_attach(s.c, box, 0, third, 5, third, 1e-4, &id));
    CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_CONVERGED);
    CHECK(settle(&s, 900));
    CHECK(!cloth_collide_pose(s.c, box, NULL, p));      /* far, but it carries the spring's end */
    CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_CONVERGED);
    CHECK(settle(&s, 900));
    CHECK(!clothi_contact_moves(s.c));
    s.c->nhold = 1;
    CHECK(clothi_contact_moves(s.c));
    s.c->nhold = 0;
    raze(&s);
}

/* Contact that goes and comes wakes: nothing is under the sheet any more. */
static void contact_made_anew(void) {
    cloth_report r;
    double       y;
    scene        s;
    build(&s, PLANE, CLOTH_INTEGRATOR_EULER, SLEEP);
    CHECK(settle(&s, 900));
    cloth_collide_destroy(s.c);
    CHECK(!cloth_collide_create(s.sim, NULL, &s.c));
    y = cloth_sim_state(s.sim)->x[1];
    CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_CONVERGED);
    CHECK(cloth_sim_state(s.sim)->x[1] < y);
    raze(&s);
}

/* --- who never sleeps --- */

static void pendulum(void) {
    static const cloth_integrator by[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                           CLOTH_INTEGRATOR_LEAPFROG};
    int k, i, turns;
    for (k = 0; k < 3; k++) {
        scene        s;
        cloth_report r;
        double       before = 0;
        build(&s, HANG, by[k], 0.1);
        for (i = turns = 0; i < 180; i++) {
            const double *v = cloth_sim_state(s.sim)->v + 3 * 76;
            CHECK(!cloth_step(s.sim, H, &r) && r.outcome == CLOTH_STEP_CONVERGED);
            turns += v[1] * before < 0;
            before = v[1];
        }
        printf("  integrator %d: %d turning points in 3 s\n", (int)by[k], turns);
        CHECK(turns >= 4);
        raze(&s);
    }
}

/* On a conveyor at eight times and at once tolerance/sleep. */
static void creep(void) {
    int k, i, slept = 0;
    for (k = 0; k < 2; k++) {
        scene        s;
        double       v[3] = {0, 0, 0}, from;
        cloth_report r;
        build(&s, PLANE, CLOTH_INTEGRATOR_EULER, SLEEP);
        v[0] = (k ? 1 : 8) * s.desc.tolerance / SLEEP;
        CHECK(settle(&s, 900));
        from = cloth_sim_state(s.sim)->x[120];
        CHECK(!cloth_collide_set_surface(s.c, s.plane, v, NULL));
        for (i = slept = 0; i < 300; i++) {
            CHECK(!cloth_step(s.sim, H, &r));
            slept += r.outcome == CLOTH_STEP_ASLEEP;
        }
        printf("  conveyor at %.1e m/s: went %.2e m in 5 s, %d of 300 steps asleep\n", v[0],
               cloth_sim_state(s.sim)->x[120] - from, slept);
        if (k == 0) CHECK(!slept && cloth_sim_state(s.sim)->x[120] - from > 4 * v[0]);
        else CHECK(slept > 200);
        raze(&s);
    }
}

static void never_sleeps(void) {
    pendulum();
    creep();
}

/* --- state --- */

enum { ROLL = 150 };

typedef struct roll {                       /* what the recorder heard                         */
    cloth_step_record r[ROLL];
    void             *state[ROLL];
    uint64_t          hash[ROLL];
    int               n;
} roll;

static void on_step(void *user, const cloth_step_record *record) {
    roll *k = (roll *)user;
    if (k->n == ROLL) return;
    k->r[k->n] = *record;
    k->state[k->n] = malloc(record->bytes);
    memcpy(k->state[k->n], record->state, record->bytes);
    k->r[k->n].state = k->state[k->n];
    k->n++;
}

/* A snapshot of every 7th step goes on alike in another sim, and every record gives its step. */
static void same_bits(int kind, cloth_integrator integrator) {
    static roll    heard_steps;
    scene          s, t;
    const double   up[3] = {0.1, 0.02, 0.1};
    cloth_recorder recorder = {&heard_steps, NULL, on_step};
    cloth_report   r;
    uint64_t       was;
    double         still;
    void          *saved;
    size_t         size;
    int            i, k, asleep = 0, compared = 0;
    memset(&heard_steps, 0, sizeof heard_steps);
    build(&s, kind, integrator, SLEEP);
    build(&t, kind, integrator, SLEEP);
    if (kind == HANG) hang(&s);
    CHECK(!cloth_sim_set_recorder(s.sim, &recorder));
    for (i = 0; i < ROLL; i++) {
        if (i == 120) CHECK(!cloth_sim_pin(s.sim, 40, CLOTH_AXIS_ALL, up));
        if (i % 7 == 0) {
            size = cloth_sim_save_size(s.sim);
            saved = malloc(size);
            CHECK(saved && !cloth_sim_save(s.sim, saved, size));
            CHECK(!cloth_sim_restore(t.sim, saved, size));
            CHECK(cloth_sim_hash(s.sim) == cloth_sim_hash(t.sim));
            free(saved);
        } else if (i == 120)
            CHECK(!cloth_sim_pin(t.sim, 40, CLOTH_AXIS_ALL, up));
        CHECK(!cloth_step(s.sim, H, &r) && !cloth_step(t.sim, H, NULL));
        asleep += r.outcome == CLOTH_STEP_ASLEEP;
        compared += cloth_sim_hash(s.sim) == cloth_sim_hash(t.sim);
        heard_steps.hash[i] = cloth_sim_hash(s.sim);
    }
    printf("  kind %d, integrator %d: %d of %d steps asleep\n", kind, (int)integrator, asleep,
           ROLL);
    CHECK(asleep > 10 && asleep < 120 && compared == ROLL && heard_steps.n == ROLL);
    CHECK(!cloth_sim_set_recorder(s.sim, NULL));
    for (k = ROLL - 1; k >= 0; k--) {
        CHECK(!cloth_step_replay(t.sim, heard_steps.r + k, &r));
        CHECK(cloth_sim_hash(t.sim) == heard_steps.hash[k]);
        CHECK(r.outcome == heard_steps.r[k].outcome);
        free(heard_steps.state[k]);
    }
    was = cloth_sim_hash(s.sim);            /* a sim that nobody could have saved */
    still = s.sim->still;
    s.sim->still = -1;
    size = cloth_sim_save_size(s.sim);
    saved = malloc(size);
    CHECK(saved && !cloth_sim_save(s.sim, saved, size));
    s.sim->still = still;
    CHECK(cloth_sim_restore(s.sim, saved, size) == CLOTH_ERR_FORMAT);
    CHECK(cloth_sim_hash(s.sim) == was && strstr(s.heard->text, "still"));
    free(saved);
    raze(&s), raze(&t);
}

/* A step asleep is taken whole, also in a sim that has not seen the one that fell asleep. */
static void whole_step(void) {
    scene        s, t;
    cloth_report r;
    void        *saved;
    size_t       size;
    build(&s, PLANE, CLOTH_INTEGRATOR_EULER, SLEEP);
    build(&t, PLANE, CLOTH_INTEGRATOR_EULER, SLEEP);
    CHECK(settle(&s, 900));
    size = cloth_sim_save_size(s.sim);
    saved = malloc(size);
    CHECK(saved && !cloth_sim_save(s.sim, saved, size) && !cloth_sim_restore(t.sim, saved, size));
    CHECK(!cloth_collide_step(t.c, H, 2, &r) && r.outcome == CLOTH_STEP_ASLEEP);
    CHECK_NEAR(cloth_collide_last(t.c).fraction, 1, 0);
    free(saved);
    raze(&s), raze(&t);
}

static void restored(void) {
    same_bits(HANG, CLOTH_INTEGRATOR_EULER);
    same_bits(HANG, CLOTH_INTEGRATOR_BDF2);
    same_bits(PLANE, CLOTH_INTEGRATOR_EULER);
}

/* Who does not ask has no such state; a timer that never ends changes no motion. */
static void not_asked(void) {
    scene s, t;
    int   i;
    build(&s, PLANE, CLOTH_INTEGRATOR_EULER, 0);
    build(&t, PLANE, CLOTH_INTEGRATOR_EULER, 1e9);
    CHECK(cloth_desc_default().sleep == 1);
    CHECK(cloth_model_hash(s.model) != cloth_model_hash(t.model));
    CHECK(cloth_sim_save_size(t.sim) - cloth_sim_save_size(s.sim) ==
          (1 + 3 * (size_t)s.desc.nv) * sizeof(double));
    for (i = 0; i < 120; i++) CHECK(!cloth_step(s.sim, H, NULL) && !cloth_step(t.sim, H, NULL));
    CHECK(!memcmp(cloth_sim_state(s.sim)->x, cloth_sim_state(t.sim)->x,
                  3 * (size_t)s.desc.nv * sizeof(double)));
    CHECK(!memcmp(cloth_sim_state(s.sim)->v, cloth_sim_state(t.sim)->v,
                  3 * (size_t)s.desc.nv * sizeof(double)));
    CHECK(!s.sim->still_x);
    raze(&s), raze(&t);
}

static void refusals(void) {
    static const struct { double value; cloth_status status; const char *text; } bad[3] = {
        {-1, CLOTH_ERR_ARGUMENT, "desc.sleep = -1 must be at least 0"},
        {NAN, CLOTH_ERR_NONFINITE, "desc.sleep = NaN is not finite"},
        {INFINITY, CLOTH_ERR_NONFINITE, "desc.sleep = inf is not finite"}};
    scene        s;
    cloth_model *model;
    int          i;
    build(&s, HANG, CLOTH_INTEGRATOR_EULER, 0);
    for (i = 0; i < 3; i++) {
        s.desc.sleep = bad[i].value;
        CHECK(cloth_model_create(&s.desc, &model) == bad[i].status && !model);
        CHECK(strstr(s.heard->text, bad[i].text));
    }
    raze(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(falls_asleep);
    RUN(asleep_for_any_time);
    RUN(wakes);
    RUN(sleeps_on);
    RUN(material_said_again);
    RUN(obstacles_wake);
    RUN(contact_made_anew);
    RUN(never_sleeps);
    RUN(restored);
    RUN(whole_step);
    RUN(not_asked);
    RUN(refusals);
    return TEST_END();
}
