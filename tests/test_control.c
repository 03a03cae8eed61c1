/* test_control.c - run-time control between steps, and what hosts ask of a sim: pins, attachments
 * and their handles, forces, params, reset, threads, allocations, float buffers, rays, drawing.
 *   cc -std=c99 -O2 -ffp-contract=off -pthread -DCLOTHSIM_IMPLEMENTATION -I.. test_control.c \
 *      -o test_control -lm && ./test_control */
#include "clothsim.h"
#include <pthread.h>
#include "test.h"
#include "scene.h"

static host        told;
static scene       S;
static cloth_hooks hooks;

static void open_as(cloth_integrator integrator, int with) {
    scene_close(&S);
    hooks = host_hooks(&told);
    S = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, integrator, &hooks, with);
}

/* The call returned `want`, said `word`, and left the sim as it was. */
static uint64_t before;

static int kept(cloth_status got, cloth_status want, const char *word) {
    int good = got == want && strstr(told.text, word) != NULL && cloth_sim_hash(S.sim) == before;
    if (!good)
        printf("  got %d, wanted %d, hash %s, said: %s\n", (int)got, (int)want,
               cloth_sim_hash(S.sim) == before ? "kept" : "changed", told.text);
    host_forget(&told);
    return good;
}

static void pins_refused(void) {
    static const double good[3] = {0, 0, 0};
    double              bad[3] = {0, NAN, 0};
    open_as(CLOTH_INTEGRATOR_EULER, WITH_PINS);
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_pin(NULL, 0, 7, good), CLOTH_ERR_ARGUMENT, ""));
    CHECK(kept(cloth_sim_pin(S.sim, -1, 7, good), CLOTH_ERR_ARGUMENT, "vertex = -1"));
    CHECK(kept(cloth_sim_pin(S.sim, S.nv, 7, good), CLOTH_ERR_ARGUMENT, "vertex"));
    CHECK(kept(cloth_sim_pin(S.sim, 1, 0, good), CLOTH_ERR_ARGUMENT, "axes = 0"));
    CHECK(kept(cloth_sim_pin(S.sim, 1, 8, good), CLOTH_ERR_ARGUMENT, "axes = 8"));
    CHECK(kept(cloth_sim_pin(S.sim, 1, 7, bad), CLOTH_ERR_NONFINITE, "target[1] = NaN"));
    CHECK(kept(cloth_sim_unpin(NULL, 1), CLOTH_ERR_ARGUMENT, ""));
    CHECK(kept(cloth_sim_unpin(S.sim, S.nv), CLOTH_ERR_ARGUMENT, "vertex"));
    CHECK(cloth_sim_pin(S.sim, 1, 5, bad) == CLOTH_OK);     /* only the named axes are read */
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
}

static void pins_hold_and_let_go(void) {
    double to[3], was;
    int    kind;
    FOR_INTEGRATORS(kind) {
        open_as((cloth_integrator)kind, 0);
        memcpy(to, cloth_sim_state(S.sim)->x, sizeof to);
        was = to[1];
        CHECK(cloth_sim_pin(S.sim, 0, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.02, NULL) == CLOTH_OK);
        CHECK(cloth_sim_state(S.sim)->x[1] == was && fabs(cloth_sim_state(S.sim)->v[1]) < 1e-15);
        to[1] += 0.01;
        CHECK(cloth_sim_pin(S.sim, 0, CLOTH_AXIS_ALL, to) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.02, NULL) == CLOTH_OK);
        CHECK(cloth_sim_state(S.sim)->x[1] == to[1]);
        CHECK(cloth_sim_unpin(S.sim, 0) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.02, NULL) == CLOTH_OK);
        CHECK(cloth_sim_state(S.sim)->x[1] != to[1]);
    }
}

static void attachments(void) {
    static const double bary[3] = {0.2, 0.3, 0.5}, off[3] = {0.2, 0.3, 0.4}, up[3] = {0, 0.1, 0};
    double              bad[3] = {NAN, 0, 1}, far[3] = {0.1, 0.9, 0};
    cloth_attachment    id, other, none = {0};
    int                 k;
    open_as(CLOTH_INTEGRATOR_EULER, 0);
    before = cloth_sim_hash(S.sim);
    id.id = 77;
    CHECK(kept(cloth_sim_attach(S.sim, -1, bary, 1, up, &id), CLOTH_ERR_ARGUMENT, "face -1"));
    CHECK(id.id == 0);
    CHECK(kept(cloth_sim_attach(S.sim, S.mesh->nf, bary, 1, up, &id), CLOTH_ERR_ARGUMENT, "nf"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, bad, 1, up, &id), CLOTH_ERR_NONFINITE, "bary"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, off, 1, up, &id), CLOTH_ERR_ARGUMENT, "0.9"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, bary, -1, up, &id), CLOTH_ERR_ARGUMENT, "-1"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, bary, NAN, up, &id), CLOTH_ERR_NONFINITE, "k"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, bary, 1, bad, &id), CLOTH_ERR_NONFINITE, "target"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, NULL, 1, up, &id), CLOTH_ERR_ARGUMENT, "bary is NULL"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, bary, 1, NULL, &id), CLOTH_ERR_ARGUMENT, "target is"));
    CHECK(kept(cloth_sim_attach(S.sim, 1, bary, 1, up, NULL), CLOTH_ERR_ARGUMENT, "id is NULL"));
    CHECK(kept(cloth_sim_attach(NULL, 1, bary, 1, up, &id), CLOTH_ERR_ARGUMENT, ""));
    CHECK(kept(cloth_sim_detach(S.sim, none), CLOTH_ERR_HANDLE, "attachment 0 is gone"));
    other.id = 0xffffffffu;
    CHECK(kept(cloth_sim_detach(S.sim, other), CLOTH_ERR_HANDLE, "attachment 4294967295 is"));
    CHECK(kept(cloth_sim_attach_move(S.sim, none, up), CLOTH_ERR_HANDLE, "gone"));

    CHECK(cloth_sim_attach(S.sim, 1, bary, 50, far, &id) == CLOTH_OK && id.id != 0);
    for (k = 0; k < 20; k++) CHECK(cloth_step(S.sim, 0.02, NULL) == CLOTH_OK);
    CHECK(cloth_sim_attach_move(S.sim, id, up) == CLOTH_OK);
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_attach_move(S.sim, id, bad), CLOTH_ERR_NONFINITE, "NaN"));
    CHECK(kept(cloth_sim_attach_move(S.sim, id, NULL), CLOTH_ERR_ARGUMENT, "target is NULL"));
    CHECK(cloth_sim_detach(S.sim, id) == CLOTH_OK);
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_detach(S.sim, id), CLOTH_ERR_HANDLE, "gone"));
    /* the place is used again: the old handle fits no new tenant, the 65 536th neither */
    CHECK(cloth_sim_attach(S.sim, 2, bary, 1, up, &other) == CLOTH_OK && other.id != id.id);
    for (k = 1; k < 65536; k++)
        if (cloth_sim_detach(S.sim, other) || cloth_sim_attach(S.sim, 2, bary, 1, up, &other))
            break;
    CHECK(k == 65536 && other.id != id.id);
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_attach_move(S.sim, id, up), CLOTH_ERR_HANDLE, "gone"));
    /* neither do handles from before a reset */
    CHECK(cloth_sim_reset(S.sim) == CLOTH_OK);
    CHECK(cloth_sim_attach(S.sim, 2, bary, 1, up, &id) == CLOTH_OK && other.id != id.id);
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_detach(S.sim, other), CLOTH_ERR_HANDLE, "gone"));
    for (k = 1; k < CLOTH_DEFAULT_ATTACHMENTS; k++)
        CHECK(cloth_sim_attach(S.sim, k % S.mesh->nf, bary, 1, up, &other) == CLOTH_OK);
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_attach(S.sim, 0, bary, 1, up, &id), CLOTH_ERR_CAPACITY, "64"));
    CHECK(id.id == 0);
    /* to a cloth that is nowhere nothing is attached */
    CHECK(cloth_sim_detach(S.sim, other) == CLOTH_OK);
    cloth_sim_state(S.sim)->x[0] = NAN;
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_sim_attach(S.sim, 0, bary, 1, up, &id), CLOTH_ERR_NONFINITE, "state.x"));
    /* nor pinned where it is */
    CHECK(kept(cloth_sim_pin(S.sim, 0, CLOTH_AXIS_X, NULL), CLOTH_ERR_NONFINITE, "NaN"));
}

static void forces_gravity_wind(void) {
    double f[300], g[3] = {0, 1, INFINITY}, w[3] = {NAN, 0, 0};
    int    i;
    open_as(CLOTH_INTEGRATOR_EULER, WITH_PINS);
    before = cloth_sim_hash(S.sim);
    for (i = 0; i < 300; i++) f[i] = 1e-3;
    CHECK(cloth_sim_set_force(S.sim, f) == CLOTH_OK && cloth_sim_hash(S.sim) != before);
    CHECK(cloth_sim_set_force(S.sim, NULL) == CLOTH_OK && cloth_sim_hash(S.sim) == before);
    f[3 * S.nv - 1] = NAN;
    CHECK(kept(cloth_sim_set_force(S.sim, f), CLOTH_ERR_NONFINITE, "NaN"));
    CHECK(kept(cloth_sim_set_force(NULL, f), CLOTH_ERR_ARGUMENT, ""));
    CHECK(kept(cloth_sim_set_gravity(S.sim, g), CLOTH_ERR_NONFINITE, "inf"));
    CHECK(kept(cloth_sim_set_gravity(S.sim, NULL), CLOTH_ERR_ARGUMENT, "g is NULL"));
    CHECK(kept(cloth_sim_set_wind(S.sim, w), CLOTH_ERR_NONFINITE, "NaN"));
    CHECK(kept(cloth_sim_set_wind(NULL, w), CLOTH_ERR_ARGUMENT, ""));
    /* without gravity and forces a flat sheet stays */
    g[1] = g[2] = 0;
    CHECK(cloth_sim_set_gravity(S.sim, g) == CLOTH_OK);
    CHECK(cloth_step(S.sim, 0.1, NULL) == CLOTH_OK);
    CHECK_NEAR(cloth_sim_state(S.sim)->x[3 * 7 + 1], 0, 1e-15);
    w[0] = 0;
    w[1] = 2;
    CHECK(cloth_sim_set_wind(S.sim, w) == CLOTH_OK && cloth_step(S.sim, 0.1, NULL) == CLOTH_OK);
    CHECK(cloth_sim_state(S.sim)->x[3 * 7 + 1] > 1e-4);
    CHECK(cloth_sim_set_wind(S.sim, NULL) == CLOTH_OK);
}

/* What is refused is not seen by the next step, in any integrator: same bits as a twin's. */
static void refused_params_change_nothing(void) {
    cloth_sim     *twin;
    cloth_material m;
    int            kind, k;
    FOR_INTEGRATORS(kind)
        for (k = 0; k < 8; k++) {
            cloth_params *p;
            open_as((cloth_integrator)kind, WITH_PINS | WITH_NOISE);
            CHECK(cloth_sim_create(S.model, &twin) == CLOTH_OK);
            CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
            CHECK(cloth_step(twin, 0.01, NULL) == CLOTH_OK);
            p = cloth_sim_params(S.sim);
            before = cloth_sim_hash(S.sim);
            CHECK(p != NULL && before == cloth_sim_hash(twin));
            if (k == 0) p->mass[2] = -1, p->mass_given = 1;
            if (k == 1) p->mass[2] = NAN, p->mass_given = 1;
            if (k == 2) p->X[8] = INFINITY;
            if (k == 3) p->X[6] = p->X[8], p->X[7] = p->X[9];
            if (k == 4) p->hinge_scale[1] = -2;
            if (k == 5) p->theta0[1] = NAN;
            if (k == 6) p->material[0].density = 0;
            if (k == 7) p->material[0].density = 1e-322;    /* masses of 0 */
            p->theta0[0] = 1;                           /* good, but in bad company */
            CHECK(kept(cloth_sim_params_changed(S.sim),
                       k == 1 || k == 2 || k == 5 ? CLOTH_ERR_NONFINITE
                                                  : k == 3 ? CLOTH_ERR_MESH : CLOTH_ERR_ARGUMENT,
                       k < 2 ? "mass[2]" : k == 2 ? "X[8]" : k == 3 ? "triangle 1"
                             : k == 4 ? "hinge_scale[1]" : k == 5 ? "theta0" : "density"));
            memset(&m, 0, sizeof m);
            CHECK(kept(cloth_sim_set_material(S.sim, 0, &m), CLOTH_ERR_ARGUMENT, "density"));
            m = S.desc.material, m.density = 1e-322;
            CHECK(kept(cloth_sim_set_material(S.sim, 0, &m), CLOTH_ERR_ARGUMENT, "density"));
            CHECK(kept(cloth_sim_set_material(S.sim, 1, &m), CLOTH_ERR_ARGUMENT, "region = 1"));
            CHECK(kept(cloth_sim_set_material(S.sim, 0, NULL), CLOTH_ERR_ARGUMENT, ""));
            CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
            CHECK(cloth_step(twin, 0.01, NULL) == CLOTH_OK);
            CHECK(cloth_sim_hash(S.sim) == cloth_sim_hash(twin));
            /* mended, it goes through */
            CHECK(cloth_sim_reset(S.sim) == CLOTH_OK && p->theta0[0] != 1);
            p->theta0[0] = 1;
            CHECK(cloth_sim_params_changed(S.sim) == CLOTH_OK);
            cloth_sim_destroy(twin);
        }
    scene_close(&S);
    scene_desc(&S, 4, &hooks, 0);
    S.desc.bend = CLOTH_BEND_QUADRATIC;
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    before = cloth_sim_hash(S.sim);
    cloth_sim_params(S.sim)->theta0[1] = 0.1;
    CHECK(kept(cloth_sim_params_changed(S.sim), CLOTH_ERR_UNSUPPORTED, "theta0[1] = 0.1"));
    cloth_sim_state(S.sim)->t = NAN;
    before = cloth_sim_hash(S.sim);
    CHECK(kept(cloth_step(S.sim, 0.01, NULL), CLOTH_ERR_NONFINITE, "state.t = "));
    CHECK(cloth_sim_params(NULL) == NULL);
    CHECK(cloth_sim_params_changed(NULL) == CLOTH_ERR_ARGUMENT);
}

static void params_take_effect(void) {
    cloth_params  *p;
    cloth_material m, dirty;
    double         mass;
    uint64_t       clean;
    open_as(CLOTH_INTEGRATOR_EULER, WITH_PINS);
    p = cloth_sim_params(S.sim);
    mass = p->mass[0];
    p->material[0].density *= 2;
    CHECK(cloth_sim_params_changed(S.sim) == CLOTH_OK);
    CHECK_REL(p->mass[0], 2 * mass, 1e-15);
    before = cloth_sim_hash(S.sim);
    m = p->material[0];
    m.density /= 2;
    CHECK(cloth_sim_set_material(S.sim, 0, &m) == CLOTH_OK);
    CHECK_REL(p->mass[0], mass, 1e-15);     /* the host's copy follows */
    /* padding in a host's struct is not part of anything */
    clean = cloth_sim_hash(S.sim);
    memset(&dirty, 0x5a, sizeof dirty);
    dirty.density = m.density;
    dirty.young = m.young;
    dirty.thickness = m.thickness;
    dirty.membrane = m.membrane;
    dirty.poisson = m.poisson;
    dirty.bending = m.bending;
    dirty.damping = m.damping;
    dirty.plane = m.plane;
    CHECK(cloth_sim_set_material(S.sim, 0, &dirty) == CLOTH_OK && cloth_sim_hash(S.sim) == clean);
}

/* A rest angle is one by its direction: whole turns more are the same, in energy and in force. */
static void rest_angle_by_whole_turns(void) {
    static const double turns[3] = {0, 6.283185307179586, -12.566370614359172};
    double              E[3] = {0, 0, 0}, f[3][3] = {{0}};
    double             *grad;
    int                 i, k;
    open_as(CLOTH_INTEGRATOR_EULER, WITH_PINS | WITH_NOISE);
    grad = (double *)calloc(3 * (size_t)S.nv, sizeof *grad);
    for (k = 0; k < 3; k++) {
        cloth_params *p = cloth_sim_params(S.sim);
        for (i = 0; i < p->nh; i++) p->theta0[i] = 1 + 0.5 * (i % 3) + turns[k];
        CHECK(cloth_sim_params_changed(S.sim) == CLOTH_OK);
        CHECK(cloth_sim_potential(S.sim, cloth_sim_state(S.sim)->x, &E[k], grad) == CLOTH_OK);
        memcpy(f[k], grad + 3 * (S.nv / 2), sizeof f[k]);
        CHECK_REL(E[k], E[0], 1e-12);
        for (i = 0; i < 3; i++) CHECK_NEAR(f[k][i], f[0][i], 1e-9 * (1 + fabs(f[0][i])));
    }
    free(grad);
}

static void reset_is_fresh(void) {
    static const double bary[3] = {0.2, 0.3, 0.5}, up[3] = {0, 0.1, 0}, g[3] = {1, 2, 3};
    double              f[300] = {0};
    cloth_attachment    id;
    cloth_material      m;
    cloth_report        r;
    uint64_t            fresh;
    int                 kind, k;
    CHECK(cloth_sim_reset(NULL) == CLOTH_ERR_ARGUMENT);
    FOR_INTEGRATORS(kind) for (k = 0; k < 2; k++) {     /* k: wind in the desc                 */
        cloth_sim *twin;
        open_as((cloth_integrator)kind, (k ? WITH_ALL & ~WITH_ATTACH & ~WITH_FORCE
                                           : WITH_NOISE | WITH_DAMPING | WITH_PINS));
        fresh = cloth_sim_hash(S.sim);
        f[4] = 0.01;
        m = S.desc.material;
        m.bending *= 3;
        CHECK(cloth_sim_attach(S.sim, 3, bary, 9, up, &id) == CLOTH_OK);
        CHECK(cloth_sim_pin(S.sim, 4, 7, up) == CLOTH_OK);
        CHECK(cloth_sim_unpin(S.sim, 0) == CLOTH_OK);
        CHECK(cloth_sim_set_force(S.sim, f) == CLOTH_OK);
        CHECK(cloth_sim_set_gravity(S.sim, g) == CLOTH_OK);
        CHECK(cloth_sim_set_wind(S.sim, g) == CLOTH_OK);
        CHECK(cloth_sim_set_material(S.sim, 0, &m) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
        CHECK(cloth_sim_hash(S.sim) != fresh);
        CHECK(cloth_sim_reset(S.sim) == CLOTH_OK && cloth_sim_hash(S.sim) == fresh);
        /* and goes on like one */
        CHECK(cloth_sim_create(S.model, &twin) == CLOTH_OK);
        CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_OK && (r.counts.wind_faces > 0) == k);
        CHECK(cloth_step(twin, 0.01, NULL) == CLOTH_OK);
        CHECK(cloth_sim_hash(S.sim) == cloth_sim_hash(twin));
        cloth_sim_destroy(twin);
    }
}

/* --- threads --- */

typedef struct run {
    cloth_sim *sim;
    double     wind;
    uint64_t   hash;
} run;

static void *run_steps(void *ctx) {
    run   *r = (run *)ctx;
    double w[3] = {0, 0, 0};
    int    k;
    w[0] = r->wind;
    (void)cloth_sim_set_wind(r->sim, w);
    for (k = 0; k < 15; k++) (void)cloth_step(r->sim, 0.01, NULL);
    r->hash = cloth_sim_hash(r->sim);
    return NULL;
}

static void sims_in_threads(void) {
    int kind, k;
    FOR_INTEGRATORS(kind) {
        run       alone[2], both[2];
        pthread_t thread[2];
        scene_close(&S);                    /* malloc: the counting host is one thread's */
        S = scene_make(6, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, (cloth_integrator)kind, NULL,
                       WITH_ALL);
        for (k = 0; k < 2; k++) {
            CHECK(cloth_sim_create(S.model, &alone[k].sim) == CLOTH_OK);
            CHECK(cloth_sim_create(S.model, &both[k].sim) == CLOTH_OK);
            alone[k].wind = both[k].wind = 1.0 + k;
            run_steps(&alone[k]);
        }
        for (k = 0; k < 2; k++) CHECK(!pthread_create(&thread[k], NULL, run_steps, &both[k]));
        for (k = 0; k < 2; k++) CHECK(!pthread_join(thread[k], NULL));
        for (k = 0; k < 2; k++) {
            CHECK(alone[k].hash == both[k].hash);
            cloth_sim_destroy(alone[k].sim);
            cloth_sim_destroy(both[k].sim);
        }
        CHECK(alone[0].hash != alone[1].hash);
    }
}

static void no_allocation_after_the_first_step(void) {
    static const double bary[3] = {0.2, 0.3, 0.5}, up[3] = {0, 0.1, 0};
    cloth_attachment    id;
    cloth_report        r;
    long long           calls;
    int                 kind, b, m, k;
    FOR_INTEGRATORS(kind)
        for (m = CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++)
            for (b = CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++) {
                scene_close(&S);
                hooks = host_hooks(&told);
                S = scene_make(5, (cloth_membrane)m, (cloth_bend_model)b, (cloth_integrator)kind,
                               &hooks, WITH_ALL);
                CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_OK && r.counts.allocations > 0);
                calls = told.calls;
                for (k = 0; k < 8; k++) {
                    CHECK(cloth_step(S.sim, 0.01, k % 2 ? &r : NULL) == CLOTH_OK);
                    if (k % 2) CHECK(r.counts.allocations == 0);
                    CHECK(cloth_sim_pin(S.sim, k, 7, NULL) == CLOTH_OK);
                    CHECK(cloth_sim_attach(S.sim, k, bary, 2, up, &id) == CLOTH_OK);
                }
                CHECK(calls == told.calls);
                scene_close(&S);
                CHECK(told.live == 0);
            }
}

/* --- for hosts that draw --- */

static void float_buffers(void) {
    static const double nowhere[3] = {0, NAN, 0};
    struct { float pos[3], nrm[3]; int tag; } v[40];
    float  flat[120], n2;
    double origin[3] = {1e5, -2e5, 3e5}, *x;
    int    i, k;
    open_as(CLOTH_INTEGRATOR_EULER, WITH_NOISE);
    x = cloth_sim_state(S.sim)->x;
    for (i = 0; i < 3 * S.nv; i++) x[i] += origin[i % 3];
    memset(v, 0, sizeof v);
    for (i = 0; i < 40; i++) v[i].tag = i;
    CHECK(cloth_sim_vertices_f32(S.sim, origin, v[0].pos, v[0].nrm, sizeof v[0]) == CLOTH_OK);
    CHECK(cloth_sim_vertices_f32(S.sim, origin, flat, NULL, 0) == CLOTH_OK);
    for (i = 0; i < S.nv; i++) {
        for (k = 0; k < 3; k++) {
            CHECK_NEAR(v[i].pos[k], x[3 * i + k] - origin[k], 1e-7);
            CHECK(v[i].pos[k] == flat[3 * i + k]);
        }
        n2 = v[i].nrm[0] * v[i].nrm[0] + v[i].nrm[1] * v[i].nrm[1] + v[i].nrm[2] * v[i].nrm[2];
        CHECK_NEAR(n2, 1, 1e-6);
        CHECK(v[i].nrm[1] > 0.7f && v[i].tag == i);
    }
    for (; i < 40; i++) CHECK(fabs((double)v[i].pos[0]) <= 0 && v[i].tag == i);
    /* one vertex by hand: area-weighted mean of its faces */
    {
        const cloth_topology *t = cloth_model_topology(S.model);
        double                n[3] = {0, 0, 0}, len;
        for (k = t->vf_start[7]; k < t->vf_start[8]; k++) {
            const int *f = S.mesh->faces + 3 * t->vf[k];
            double     a[3], b[3];
            for (i = 0; i < 3; i++) {
                a[i] = x[3 * f[1] + i] - x[3 * f[0] + i];
                b[i] = x[3 * f[2] + i] - x[3 * f[0] + i];
            }
            n[0] += a[1] * b[2] - a[2] * b[1];
            n[1] += a[2] * b[0] - a[0] * b[2];
            n[2] += a[0] * b[1] - a[1] * b[0];
        }
        len = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (i = 0; i < 3; i++) CHECK_NEAR(v[7].nrm[i], n[i] / len, 1e-6);
    }
    CHECK(cloth_sim_vertices_f32(S.sim, NULL, NULL, NULL, 0) == CLOTH_OK);
    CHECK(cloth_sim_vertices_f32(S.sim, NULL, flat, NULL, 8) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_vertices_f32(S.sim, nowhere, flat, NULL, 0) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_vertices_f32(NULL, NULL, flat, NULL, 0) == CLOTH_ERR_ARGUMENT);
}

static void rays(void) {
    static const double down[3] = {0, -2, 0}, up[3] = {0, 1, 0}, zero[3] = {0, 0, 0};
    static const double faint[3] = {0, -1e-200, 0}, fierce[3] = {0, -1e200, 0};
    double o[3], d[3] = {NAN, 0, 0}, t, bary[3], *x;
    int    face, i, k, missed = 0, hits = 0;
    open_as(CLOTH_INTEGRATOR_EULER, 0);
    x = cloth_sim_state(S.sim)->x;
    /* the middle of every face, from both sides; nothing from behind */
    for (i = 0; i < S.mesh->nf; i++) {
        const int *f = S.mesh->faces + 3 * i;
        for (k = 0; k < 3; k++) o[k] = (x[3 * f[0] + k] + x[3 * f[1] + k] + x[3 * f[2] + k]) / 3;
        o[1] = 3;
        CHECK(cloth_sim_ray(S.sim, o, down, &t, &face, bary) == 1 && face == i);
        CHECK_NEAR(t, 1.5, 1e-12);
        CHECK(cloth_sim_ray(S.sim, o, faint, &t, &face, NULL) == 1 && face == i);
        CHECK_REL(t, 3e200, 1e-12);
        CHECK(cloth_sim_ray(S.sim, o, fierce, &t, &face, NULL) == 1 && face == i);
        CHECK_REL(t, 3e-200, 1e-12);
        for (k = 0; k < 3; k++) CHECK_NEAR(bary[k], 1.0 / 3, 1e-12);
        CHECK(cloth_sim_ray(S.sim, o, up, &t, &face, bary) == 0);
        o[1] = -3;
        CHECK(cloth_sim_ray(S.sim, o, up, NULL, NULL, NULL) == 1);
    }
    /* no gap along edges and at vertices, however the sheet lies */
    for (i = 0; i < 3 * S.nv; i++) x[i] += 0.01 * noise((unsigned)i);
    for (i = 0; i < cloth_model_topology(S.model)->nh; i++) {
        const int *e = cloth_model_topology(S.model)->hinges + 4 * i;
        double     s;
        for (s = 0; s < 1.0001; s += 0.05) {
            double dir[3] = {0.3, -1, 0.2};
            for (k = 0; k < 3; k++)
                o[k] = (1 - s) * x[3 * e[0] + k] + s * x[3 * e[1] + k] - 2.37 * dir[k];
            hits++;
            /* ends on the boundary may miss */
            if (s > 0.01 && s < 0.99) missed += !cloth_sim_ray(S.sim, o, dir, &t, &face, bary);
        }
    }
    for (i = 0; i < 9000; i++) {            /* the inner vertices, from all around above */
        const double *p = x + 3 * (6 + i % 3 + 5 * (i / 3 % 3));
        double        dir[3];
        for (k = 0; k < 3; k++) {
            o[k] = p[k] + 0.3 * noise((unsigned)(3 * i + k)) + (k == 1);
            dir[k] = p[k] - o[k];
        }
        hits++;
        missed += !cloth_sim_ray(S.sim, o, dir, &t, &face, bary) || fabs(t - 1) > 1e-12;
    }
    CHECK(missed == 0);
    if (missed) printf("  %d of %d rays at edges and vertices slipped through\n", missed, hits);
    o[0] = o[2] = 50;
    CHECK(cloth_sim_ray(S.sim, o, down, &t, &face, bary) == 0);
    CHECK(cloth_sim_ray(S.sim, o, zero, &t, &face, bary) == 0);
    CHECK(cloth_sim_ray(S.sim, o, d, &t, &face, bary) == 0);
    CHECK(cloth_sim_ray(S.sim, d, down, &t, &face, bary) == 0);
    CHECK(cloth_sim_ray(NULL, o, down, &t, &face, bary) == 0);
    CHECK(cloth_sim_ray(S.sim, NULL, down, &t, &face, bary) == 0);
    for (i = 0; i < 3 * S.nv; i++) x[i] = 0;            /* a collapsed sheet has no area to hit */
    o[0] = o[2] = 0;
    CHECK(cloth_sim_ray(S.sim, o, down, &t, &face, bary) == 0);
}

typedef struct drawn { int lines, triangles, points, texts, bad; } drawn;

static int odd(const double *a) { return !isfinite(a[0] + a[1] + a[2]); }
static void draw_line(const double a[3], const double b[3], unsigned rgb, void *user) {
    ((drawn *)user)->lines++;
    ((drawn *)user)->bad += rgb > 0xffffffu || odd(a) || odd(b);
}
static void draw_triangle(const double a[3], const double b[3], const double c[3], unsigned rgb,
                          void *user) {
    ((drawn *)user)->triangles++;
    ((drawn *)user)->bad += rgb > 0xffffffu || odd(a) || odd(b) || odd(c);
}
static void draw_point(const double a[3], double size, unsigned rgb, void *user) {
    ((drawn *)user)->points++;
    ((drawn *)user)->bad += rgb > 0xffffffu || odd(a) || !(size > 0);
}
static void draw_text(const double a[3], const char *text, unsigned rgb, void *user) {
    ((drawn *)user)->texts++;
    ((drawn *)user)->bad += rgb > 0xffffffu || odd(a) || !text;
}

static void debug_draw(void) {
    cloth_debug_draw draw;
    drawn            d = {0, 0, 0, 0, 0};
    open_as(CLOTH_INTEGRATOR_EULER, WITH_PINS | WITH_ATTACH | WITH_NOISE);
    memset(&draw, 0, sizeof draw);
    cloth_debug_draw_state(S.sim, &draw);
    cloth_debug_draw_state(S.sim, NULL);
    cloth_debug_draw_state(NULL, &draw);
    draw.line = draw_line;
    draw.triangle = draw_triangle;
    draw.point = draw_point;
    draw.text = draw_text;
    draw.user = &d;
    cloth_debug_draw_state(S.sim, &draw);
    CHECK(d.triangles == S.mesh->nf && d.points == 2 && d.texts == 1 && d.lines == S.nv + 1);
    CHECK(d.bad == 0);
}

/* A stitch is drawn to its point of the other face. */
static void text_at(const double a[3], const char *text, unsigned rgb, void *user) {
    (void)text, (void)rgb;
    memcpy(user, a, 3 * sizeof *a);
}

static void stitch_drawn(void) {
    static const double bary[3] = {0.2, 0.3, 0.5}, at[3] = {0.6, 0.3, 0.1};
    cloth_attachment    id;
    cloth_debug_draw    draw;
    double              seen[3] = {9, 9, 9}, want;
    const int          *v;
    int                 k;
    open_as(CLOTH_INTEGRATOR_EULER, WITH_NOISE);
    v = S.mesh->faces + 3 * (S.mesh->nf - 1);
    CHECK(cloth_sim_stitch(S.sim, 0, bary, 5, S.mesh->nf - 1, at, &id) == CLOTH_OK);
    memset(&draw, 0, sizeof draw);
    draw.text = text_at, draw.user = seen;
    cloth_debug_draw_state(S.sim, &draw);
    for (k = 0; k < 3; k++) {
        const double *x = cloth_sim_state(S.sim)->x + k;
        want = at[0] * x[3 * v[0]] + at[1] * x[3 * v[1]] + at[2] * x[3 * v[2]];
        CHECK_NEAR(seen[k], want, 1e-14);
    }
}

static void stretches(void) {
    double low[100], high[100], *x;
    int    i;
    open_as(CLOTH_INTEGRATOR_EULER, 0);
    x = cloth_sim_state(S.sim)->x;
    for (i = 0; i < S.nv; i++) {
        x[3 * i] *= 1.25;
        x[3 * i + 2] *= 0.8;
    }
    CHECK(cloth_sim_stretches(S.sim, low, high) == CLOTH_OK);
    for (i = 0; i < S.mesh->nf; i++) {
        CHECK_NEAR(low[i], 0.8, 1e-12);
        CHECK_NEAR(high[i], 1.25, 1e-12);
    }
    CHECK(cloth_sim_stretches(S.sim, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_sim_stretches(NULL, low, high) == CLOTH_ERR_ARGUMENT);
}

static cloth_status no_force(void *user, const cloth_eval *e, double *energy) {
    (void)user, (void)e;
    *energy = 0;
    return CLOTH_OK;
}

static void null_sims(void) {
    cloth_ledger  l;
    cloth_contact none;
    cloth_term    term;
    CHECK(cloth_sim_state(NULL) == NULL && cloth_sim_model(NULL) == NULL);
    CHECK(cloth_model_topology(NULL) == NULL && cloth_sim_hash(NULL) == 0);
    CHECK(cloth_model_hash(NULL) == 0 && cloth_sim_save_size(NULL) == 0);
    CHECK(cloth_model_blocks_per_row(NULL) <= 0);
    CHECK(cloth_step(NULL, 1, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_solve_static(NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_energy(NULL, &l) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_set_contact(NULL, NULL) == CLOTH_ERR_ARGUMENT);
    cloth_sim_state_changed(NULL);
    open_as(CLOTH_INTEGRATOR_EULER, 0);
    CHECK(cloth_sim_set_contact(S.sim, NULL) == CLOTH_OK);
    before = cloth_sim_hash(S.sim);
    memset(&none, 0, sizeof none);
    memset(&term, 0, sizeof term);
    CHECK(kept(cloth_sim_energy(S.sim, NULL), CLOTH_ERR_ARGUMENT, "ledger is NULL"));
    CHECK(kept(cloth_sim_potential(S.sim, NULL, NULL, NULL), CLOTH_ERR_ARGUMENT, "x is NULL"));
    CHECK(kept(cloth_sim_set_contact(S.sim, &none), CLOTH_ERR_ARGUMENT, "commit is NULL"));
    CHECK(kept(cloth_sim_add_term(S.sim, NULL), CLOTH_ERR_ARGUMENT, "term is NULL"));
    CHECK(kept(cloth_sim_add_term(S.sim, &term), CLOTH_ERR_ARGUMENT, "eval is NULL"));
    term.eval = no_force;
    term.stiffness = -1;
    CHECK(kept(cloth_sim_add_term(S.sim, &term), CLOTH_ERR_ARGUMENT, "stiffness = -1"));
    term.stiffness = NAN;
    CHECK(kept(cloth_sim_add_term(S.sim, &term), CLOTH_ERR_ARGUMENT, "stiffness = NaN"));
    CHECK(kept(cloth_sim_set_material(S.sim, 0, NULL), CLOTH_ERR_ARGUMENT, "m is NULL"));
    CHECK(kept(cloth_sim_save(S.sim, NULL, 9), CLOTH_ERR_ARGUMENT, "save: buf is NULL"));
    CHECK(kept(cloth_sim_restore(S.sim, NULL, 9), CLOTH_ERR_ARGUMENT, "restore: buf is NULL"));
    CHECK(kept(cloth_sim_create(S.model, NULL), CLOTH_ERR_ARGUMENT, "out is NULL"));
    CHECK(kept(cloth_model_create(&S.desc, NULL), CLOTH_ERR_ARGUMENT, "out is NULL"));
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(pins_refused);
    RUN(pins_hold_and_let_go);
    RUN(attachments);
    RUN(forces_gravity_wind);
    RUN(refused_params_change_nothing);
    RUN(params_take_effect);
    RUN(rest_angle_by_whole_turns);
    RUN(reset_is_fresh);
    RUN(sims_in_threads);
    RUN(no_allocation_after_the_first_step);
    RUN(float_buffers);
    RUN(rays);
    RUN(debug_draw);
    RUN(stitch_drawn);
    RUN(stretches);
    RUN(null_sims);
    scene_close(&S);
    return TEST_END();
}
