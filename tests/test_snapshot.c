/* test_snapshot.c - save, 20 steps, restore, 20 steps: the same hash, in the same sim and in a
 * fresh one, whatever a step depends on; what is damaged or of another model is refused.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_snapshot.c \
 *      -o test_snapshot -lm && ./test_snapshot */
#include "clothsim.h"
#include "test.h"
#include "scene.h"

static host        told;
static cloth_hooks hooks;
static scene       S;

/* --- a host's term with a state of its own: a wind-up spring on one vertex; its state also
 * grows, so that a snapshot holds another number of bytes than the sim it comes back to --- */

typedef struct winder {
    double turns[8];
    int    used;
} winder;

static cloth_status winder_begin(void *user, const cloth_eval *e) {
    winder *w = (winder *)user;
    if (e->h > 0 && w->used < 8) w->turns[w->used++] = e->x_n[10];
    if (e->h > 0) w->turns[0] += e->h;
    return CLOTH_OK;
}

static cloth_status winder_eval(void *user, const cloth_eval *e, double *energy) {
    const winder *w = (const winder *)user;
    double        f = 1e-3 * w->turns[0] + 1e-3 * w->used;
    *energy = -f * e->x[10];
    if (e->grad) e->grad[10] -= f;
    return CLOTH_OK;
}

static size_t winder_size(void *user) {
    return sizeof(double) * (size_t)(1 + ((winder *)user)->used);
}

static void winder_save(void *user, void *buf) {
    const winder *w = (const winder *)user;
    double       *out = (double *)buf;          /* aligned: a promise of the snapshot */
    out[0] = w->used;
    memcpy(out + 1, w->turns, (size_t)w->used * sizeof(double));
}

static void winder_load(void *user, const void *buf) {
    winder       *w = (winder *)user;
    const double *in = (const double *)buf;
    memset(w, 0, sizeof *w);
    w->used = (int)in[0];
    memcpy(w->turns, in + 1, (size_t)w->used * sizeof(double));
}

static void add_winder(cloth_sim *sim, winder *w, const char *name) {
    cloth_term t;
    memset(&t, 0, sizeof t);
    memset(w, 0, sizeof *w);
    t.name = name;
    t.user = w;
    t.begin = winder_begin;
    t.eval = winder_eval;
    t.save_size = winder_size;
    t.save = winder_save;
    t.load = winder_load;
    CHECK(cloth_sim_add_term(sim, &t) == CLOTH_OK);
}

/* 20 steps in which a pin and an attachment move; one step in the middle is of another length. */
static uint64_t go_on(cloth_sim *sim, cloth_attachment id) {
    double to[3] = {0, 0, 0};
    int    k;
    for (k = 0; k < 20; k++) {
        to[0] = 0.002 * k;
        CHECK(cloth_sim_pin(sim, 2, CLOTH_AXIS_X | CLOTH_AXIS_Z, to) == CLOTH_OK);
        to[1] = 0.1;
        CHECK(cloth_sim_attach_move(sim, id, to) == CLOTH_OK);
        CHECK(cloth_step(sim, k == 11 ? 0.004 : 0.008, NULL) == CLOTH_OK);
    }
    return cloth_sim_hash(sim);
}

static void change_params(cloth_sim *sim) {
    cloth_params *p = cloth_sim_params(sim);
    int           i;
    for (i = 0; i < p->nh; i++) p->hinge_scale[i] = 1 + 0.2 * noise((unsigned)i);
    for (i = 0; i < 6 * p->nf; i++) p->X[i] *= 1.01;
    p->mass[1] *= 1.5;
    p->mass_given = 1;
    CHECK(cloth_sim_params_changed(sim) == CLOTH_OK);
}

static void same_bits(void) {
    static unsigned char buf[1 << 17];
    int kind, b, m, k;
    FOR_INTEGRATORS(kind)
        for (m = CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++)
            for (b = CLOTH_BEND_NONE; b <= (int)CLOTH_BEND_HINGE; b++) {
                winder     w, wf;
                cloth_sim *fresh = NULL;
                size_t     size;
                uint64_t   at, end;
                S = scene_make(5, (cloth_membrane)m, (cloth_bend_model)b, (cloth_integrator)kind,
                               NULL, WITH_ALL);
                add_winder(S.sim, &w, "winder");
                change_params(S.sim);
                for (k = 0; k < 5; k++) CHECK(cloth_step(S.sim, 0.008, NULL) == CLOTH_OK);
                size = cloth_sim_save_size(S.sim);
                CHECK(size > 0 && size <= sizeof buf);
                memset(buf, 0xee, sizeof buf);
                CHECK(cloth_sim_save(S.sim, buf, size) == CLOTH_OK && buf[size] == 0xee);
                at = cloth_sim_hash(S.sim);
                end = go_on(S.sim, S.attachment);
                CHECK(end != at);
                CHECK(cloth_sim_restore(S.sim, buf, size) == CLOTH_OK);
                CHECK(cloth_sim_hash(S.sim) == at);
                CHECK(go_on(S.sim, S.attachment) == end);
                /* a fresh sim of the same model: handles of the old one fit */
                CHECK(cloth_sim_create(S.model, &fresh) == CLOTH_OK);
                add_winder(fresh, &wf, "winder");
                CHECK(cloth_sim_restore(fresh, buf, size) == CLOTH_OK);
                CHECK(cloth_sim_hash(fresh) == at && go_on(fresh, S.attachment) == end);
                /* what it was given, it gives back */
                CHECK(cloth_sim_restore(fresh, buf, size) == CLOTH_OK);
                memset(buf + size, 0, size);
                CHECK(2 * size <= sizeof buf && cloth_sim_save_size(fresh) == size);
                CHECK(cloth_sim_save(fresh, buf + size, size) == CLOTH_OK);
                CHECK(memcmp(buf, buf + size, size) == 0);
                cloth_sim_destroy(fresh);
                scene_close(&S);
            }
}

/* The host's copy of the params is the restored one's. */
static void params_come_back(void) {
    static unsigned char buf[1 << 17];
    double               X;
    S = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, NULL, 0);
    X = cloth_sim_params(S.sim)->X[2];
    CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
    change_params(S.sim);
    CHECK(cloth_sim_params(S.sim)->X[2] != X && cloth_sim_params(S.sim)->mass_given == 1);
    CHECK(cloth_sim_restore(S.sim, buf, sizeof buf) == CLOTH_OK);
    CHECK(cloth_sim_params(S.sim)->X[2] == X && cloth_sim_params(S.sim)->mass_given == 0);
    CHECK(cloth_sim_params_changed(S.sim) == CLOTH_OK);
    scene_close(&S);
}

/* A handle from after a snapshot does not fit what was attached after its restore. */
static void handles_after_restore(void) {
    static unsigned char buf[1 << 17];
    static const double  bary[3] = {0.2, 0.3, 0.5}, up[3] = {0, 0.1, 0};
    cloth_attachment     first, second;
    S = scene_make(4, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, NULL, 0);
    CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
    CHECK(cloth_sim_attach(S.sim, 1, bary, 1, up, &first) == CLOTH_OK);
    CHECK(cloth_sim_restore(S.sim, buf, sizeof buf) == CLOTH_OK);
    CHECK(cloth_sim_detach(S.sim, first) == CLOTH_ERR_HANDLE);
    CHECK(cloth_sim_attach(S.sim, 2, bary, 1, up, &second) == CLOTH_OK);
    CHECK(cloth_sim_detach(S.sim, first) == CLOTH_ERR_HANDLE);
    CHECK(cloth_sim_detach(S.sim, second) == CLOTH_OK);
    scene_close(&S);
}

/* Nor does one from before a snapshot fit what is attached after its restore in a fresh sim. */
static void handles_in_a_fresh_sim(void) {
    static unsigned char buf[1 << 17];
    static const double  bary[3] = {0.2, 0.3, 0.5}, up[3] = {0, 0.1, 0};
    cloth_attachment     first, second, third;
    cloth_sim           *fresh = NULL;
    S = scene_make(4, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, NULL, 0);
    CHECK(cloth_sim_attach(S.sim, 1, bary, 1, up, &first) == CLOTH_OK);
    CHECK(cloth_sim_detach(S.sim, first) == CLOTH_OK);
    CHECK(cloth_sim_attach(S.sim, 1, bary, 1, up, &second) == CLOTH_OK);
    CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
    CHECK(cloth_sim_create(S.model, &fresh) == CLOTH_OK);
    CHECK(cloth_sim_restore(fresh, buf, sizeof buf) == CLOTH_OK);
    CHECK(cloth_sim_detach(fresh, second) == CLOTH_OK);
    CHECK(cloth_sim_attach(fresh, 2, bary, 1, up, &third) == CLOTH_OK);
    CHECK(cloth_sim_detach(fresh, first) == CLOTH_ERR_HANDLE);
    CHECK(cloth_sim_detach(fresh, third) == CLOTH_OK);
    cloth_sim_destroy(fresh);
    scene_close(&S);
}

/* --- refusals --- */

static int refused(const void *buf, size_t size) {
    uint64_t     before = cloth_sim_hash(S.sim);
    cloth_status status;
    int          good;
    host_forget(&told);
    status = cloth_sim_restore(S.sim, buf, size);
    good = status == CLOTH_ERR_FORMAT && told.errors == 1 && cloth_sim_hash(S.sim) == before;
    if (!good) printf("  status %d, said: %s\n", (int)status, told.text);
    return good;
}

static void damage_is_refused(void) {
    static unsigned char buf[1 << 17];
    unsigned char       *part;
    size_t               size, k;
    int                  bad = 0;
    winder               w;
    hooks = host_hooks(&told);
    S = scene_make(4, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_BDF2, &hooks,
                   WITH_ALL);
    add_winder(S.sim, &w, "winder");
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK && cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    size = cloth_sim_save_size(S.sim);
    CHECK(cloth_sim_save(S.sim, buf, size - 1) == CLOTH_ERR_CAPACITY);
    CHECK(cloth_sim_save(S.sim, NULL, size) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_save(NULL, buf, size) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_save(S.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(S.sim, NULL, size) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_restore(NULL, buf, size) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);       /* another state than the saved one */
    for (k = 0; k < size; k += k < 64 || k + 64 > size ? 1 : 61) {
        part = (unsigned char *)malloc(k + 1);              /* exact size: sanitizers watch */
        memcpy(part, buf, k);
        bad += !refused(part, k);
        free(part);
    }
    CHECK(bad == 0);
    for (k = 0; k < size; k += k < 64 || k + 64 > size ? 1 : 13) {
        buf[k] ^= (unsigned char)(1u << k % 8);
        bad += !refused(buf, size);
        buf[k] ^= (unsigned char)(1u << k % 8);
    }
    CHECK(bad == 0);
    CHECK(cloth_sim_restore(S.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(S.sim, buf, sizeof buf) == CLOTH_OK);   /* larger: fine */
    scene_close(&S);
    CHECK(told.live == 0);
}

/* Another mesh, rung, tolerance or list of host's terms. */
static void another_model_is_refused(void) {
    static unsigned char buf[1 << 17];
    int    k;
    winder w;
    for (k = 0; k < 8; k++) {
        hooks = host_hooks(&told);
        S = scene_make(4, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, &hooks, 0);
        if (k == 6) add_winder(S.sim, &w, "winder");
        CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
        scene_close(&S);
        scene_desc(&S, k == 0 ? 5 : 4, &hooks, 0);
        if (k == 1) S.desc.bend = CLOTH_BEND_NONE;
        if (k == 2) S.desc.integrator = CLOTH_INTEGRATOR_BDF2;
        if (k == 3) S.desc.tolerance *= 2;
        if (k == 4) S.desc.lift = 0.7;
        if (k == 5) S.mesh->x[4] += 1e-9;
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        if (k == 6) add_winder(S.sim, &w, "other");
        if (k == 7) add_winder(S.sim, &w, "winder");
        CHECK(refused(buf, sizeof buf));
        scene_close(&S);
        CHECK(told.live == 0);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(same_bits);
    RUN(params_come_back);
    RUN(handles_after_restore);
    RUN(handles_in_a_fresh_sim);
    RUN(damage_is_refused);
    RUN(another_model_is_refused);
    return TEST_END();
}
