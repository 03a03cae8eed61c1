/* fuzz_desc.c - a small mesh from OBJ text with a fuzzed desc: model, sim, a step, equilibrium.
 *   clang -g -O1 -fsanitize=fuzzer,address,undefined -I.. fuzz_desc.c -o fuzz_desc -lm
 *   ./fuzz_desc -max_total_time=600 -max_len=1024 -len_control=0 corpus/
 * Without libFuzzer, files are replayed:
 *   cc -std=c99 -g -O1 -fsanitize=address,undefined -DFUZZ_MAIN -I.. fuzz_desc.c -o fuzz_desc -lm
 * The first FUZZ_HEAD bytes choose the desc: a number is its default where the byte is below 128,
 * else one of a table of awkward ones. The text behind them is the mesh; without one that can be
 * read it is a square. Aborts when a promise is broken: an object or a new state without
 * CLOTH_OK, CLOTH_OK with an error logged or a state that is not finite, a refusal without a
 * sentence, a changed hash after a failed step, two runs that differ, anything left allocated. */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include <stdio.h>
#include "fuzz.h"

#define FUZZ_HEAD     48
#define FUZZ_FACES    40                    /* larger meshes only cost time                    */
#define FUZZ_PATIENCE 20                    /* iterations and substeps before a step is ended  */

typedef struct player {
    host h;
    long asked;
} player;

static int player_cancel(void *user) { return ++((player *)user)->asked > FUZZ_PATIENCE; }

static double number(bytes *h, double normal) {
    static const double odd[] = {
        0, -1, 1, 0.5, -0.5, 0.49999, 0.25, 2, 10, 1e-3, 1e-6, 1e-9, 1e-12, 1e-30, 1e-150, 1e-300,
        4.9e-324, 1e3, 1e6, 1e9, 1e12, 1e30, 1e100, 1e150, 1e300, 1.7976931348623157e308, -1e300};
    const unsigned n = (unsigned)(sizeof odd / sizeof *odd), k = next(h);
    if (k < 128) return normal;
    if (k % 32 == 31) return (double)INFINITY;
    if (k % 32 == 30) return (double)NAN;
    return odd[k % 32 % n];
}

/* in [first, last] most of the time, now and then beside it */
static int choice(bytes *h, int normal, int first, int last) {
    const unsigned k = next(h);
    if (k < 128) return normal;
    if (k == 255) return 0x7fffffff;
    if (k == 254) return -1;
    return first + (int)(k % (unsigned)(last - first + 2));
}

static void fuzz_material(bytes *h, cloth_material *m) {
    m->density = number(h, m->density);
    m->young = number(h, m->young);
    m->thickness = number(h, m->thickness);
    m->membrane = number(h, m->membrane);
    m->poisson = number(h, m->poisson);
    m->bending = number(h, m->bending);
    m->damping = number(h, m->damping);
    m->plane = (cloth_plane)choice(h, 0, 0, 1);
}

static void fuzz_desc(bytes *h, const cloth_mesh *m, cloth_pin *pins, cloth_tie *tie,
                      cloth_desc *d) {
    int k;
    d->nv = m->nv;
    d->x_rest = m->x;
    d->nf = m->nf;
    d->faces = m->faces;
    d->X = m->X;
    fuzz_material(h, &d->material);
    d->rest_angle = (cloth_rest_angle)choice(h, CLOTH_REST_ANGLE_TEMPLATE, 1, 2);
    d->membrane = (cloth_membrane)choice(h, CLOTH_MEMBRANE_STVK, 1, 2);
    d->bend = (cloth_bend_model)choice(h, CLOTH_BEND_HINGE, 1, 4);
    d->integrator = (cloth_integrator)choice(h, CLOTH_INTEGRATOR_EULER, 1, 3);
    d->substeps = choice(h, 0, 0, 3);
    d->max_newton = choice(h, 0, 0, 3);
    for (k = 0; k < 3; k++) d->gravity[k] = number(h, d->gravity[k]);
    d->wind_on = next(h) > 127;
    for (k = 0; k < 3; k++) d->wind[k] = number(h, 1);
    d->air_density = number(h, d->air_density);
    d->drag = number(h, d->drag);
    d->lift = number(h, d->lift);
    d->tolerance = number(h, d->tolerance);
    d->cg_tolerance = number(h, d->cg_tolerance);
    d->linear = (cloth_linear)choice(h, CLOTH_LINEAR_AUTO, 0, 3);
    d->max_attachments = choice(h, 2, 0, 2);
    d->npins = (int)(next(h) % 3u);
    for (k = 0; k < 2; k++) {
        pins[k].vertex = choice(h, k, 0, 3);
        pins[k].axes = (unsigned)choice(h, CLOTH_AXIS_ALL, 0, 7);
    }
    d->pins = pins;
    d->nties = next(h) > 200;
    tie->leader = choice(h, 0, 0, 3);
    tie->follower = choice(h, 2, 0, 3);
    tie->axes = (unsigned)choice(h, CLOTH_AXIS_Y, 0, 7);
    d->ties = tie;
}

/* One call that moves the state: a step, or the equilibrium where step is 0. */
static void advance(cloth_sim *sim, player *me, double step, int nv) {
    const uint64_t before = cloth_sim_hash(sim);
    const int      errors = me->h.errors;
    cloth_report   r;
    cloth_state   *s = cloth_sim_state(sim);
    cloth_status   status;
    int            i;
    me->asked = 0;
    status = step > 0 || step < 0 ? cloth_step(sim, step, &r) : cloth_solve_static(sim, &r);
    require(r.status == status);
    if (status != CLOTH_OK) {
        require(cloth_sim_hash(sim) == before);
        return;
    }
    require(me->h.errors == errors && r.outcome != CLOTH_STEP_NONE);
    for (i = 0; i < 3 * nv; i++) require(clothi_finite(s->x[i]) && clothi_finite(s->v[i]));
}

static uint64_t run(const cloth_desc *d, player *me, double step, unsigned again) {
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_status status;
    uint64_t     hash = 0;
    status = cloth_model_create(d, &model);
    require((status == CLOTH_OK) == (model != NULL) && (status == CLOTH_OK) == !me->h.errors);
    if (model && cloth_sim_create(model, &sim) == CLOTH_OK) {
        cloth_attachment id;
        const double     bary[3] = {0.25, 0.5, 0.25}, target[3] = {0, 1, 0};
        if (d->max_attachments > 1) (void)cloth_sim_attach(sim, 0, bary, 1, target, &id);
        advance(sim, me, step, d->nv);
        if (again) advance(sim, me, again == 1 ? step / 2 : 0, d->nv);
        hash = cloth_sim_hash(sim);
    }
    cloth_sim_destroy(sim);
    cloth_model_destroy(model);
    return hash;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char square[] = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0.1 1\nf 1 2 3\nf 1 3 4\n";
    const size_t      used = size < FUZZ_HEAD ? size : FUZZ_HEAD;
    cloth_obj_options opt = cloth_obj_options_default();
    cloth_desc        d = cloth_desc_default();
    cloth_mesh       *m = NULL;
    cloth_pin         pins[2];
    cloth_tie         tie;
    player            me;
    bytes             h;
    double            step;
    uint64_t          hash;
    unsigned          again;
    d.hooks = fuzz_hooks(&me.h);
    d.hooks.log.fn = NULL;                  /* the text need not be a mesh                     */
    h = fuzz_bytes(data, used);
    (void)cloth_obj_parse(&d.hooks, (const char *)data + used, size - used, &opt, &m);
    if (!m)
        require(cloth_obj_parse(&d.hooks, square, sizeof square - 1, &opt, &m) == CLOTH_OK);
    d.hooks.log.fn = fuzz_log;
    d.hooks.cancel.fn = player_cancel;
    d.hooks.cancel.user = &me;
    step = number(&h, 0.01);
    again = next(&h) % 3u;
    fuzz_desc(&h, m, pins, &tie, &d);
    if (m->nf <= FUZZ_FACES) {
        hash = run(&d, &me, step, again);
        host_forget(&me.h);
        if (again) require(run(&d, &me, step, again) == hash);
    }
    d.hooks.log.fn = NULL;
    cloth_mesh_destroy(&d.hooks, m);
    require(me.h.live == 0);
    return 0;
}

#ifdef FUZZ_MAIN
int main(int argc, char **argv) { return fuzz_replay(argc - 1, argv + 1, "fuzz_desc"); }
#endif
