/* test_record.c - a step is a function of model, params and one record: every field of the one list
 * is hashed, restored and rolled back; a recorded step replayed in a sim in another state gives the
 * same bits; what no sim would have saved is refused, and a refused call changes nothing.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_record.c -o test_record -lm && ./test_record */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include "clothsim_collide.h"
#include "test.h"
#include "scene.h"

static host  told;
static scene S;

/* --- a host's term that keeps a number, and turns on the sim when told to --- */

typedef struct meddler {
    double         sum;                     /* its own state                                   */
    unsigned char *at;                      /* byte of the sim to change in the step; NULL     */
} meddler;

static cloth_status meddler_begin(void *user, const cloth_eval *e) {
    meddler *m = (meddler *)user;
    if (e->h > 0) m->sum += e->x_n[4];
    if (!m->at || !(e->in->share[1] > 0)) return CLOTH_OK;
    *m->at ^= 1;
    return CLOTH_ERR_CANCELLED;
}

static cloth_status meddler_eval(void *user, const cloth_eval *e, double *energy) {
    const meddler *m = (const meddler *)user;
    const double   f = 1e-3 * sin(m->sum);
    *energy = -f * e->x[13];
    if (e->grad) e->grad[13] -= f;
    return CLOTH_OK;
}

static size_t meddler_size(void *user) {
    (void)user;
    return sizeof(double) - 3;              /* no multiple of 8: the top of sum is not kept    */
}

static void meddler_save(void *user, void *buf) {
    const float sum = (float)((meddler *)user)->sum;
    memset(buf, 0, meddler_size(user));
    ((meddler *)user)->sum = (double)sum;
    memcpy(buf, &sum, sizeof sum);
}

static void meddler_load(void *user, const void *buf) {
    float sum;
    memcpy(&sum, buf, sizeof sum);
    ((meddler *)user)->sum = (double)sum;
}

static void add_meddler(cloth_sim *sim, meddler *m) {
    cloth_term t;
    memset(&t, 0, sizeof t);
    memset(m, 0, sizeof *m);
    t.name = "meddler";
    t.user = m;
    t.begin = meddler_begin;
    t.eval = meddler_eval;
    t.save_size = meddler_size;
    t.save = meddler_save;
    t.load = meddler_load;
    CHECK(cloth_sim_add_term(sim, &t) == CLOTH_OK);
}

/* --- the list: every field --- */

/* Byte of a field's first or last element, or NULL: it has none here. */
static unsigned char *byte_of(const clothi_field *f, int last) {
    const size_t   n = clothi_field_count(S.sim, f);
    unsigned char *data = clothi_field_data(S.sim, f);
    if (n == 0) return NULL;
    return data + f->within + (last ? (n - 1) * f->stride + f->size - 1 : 0);
}

static void field_is_walked(const clothi_field *f, meddler *m, unsigned char *byte) {
    static unsigned char buf[1 << 17], again[1 << 17];
    const size_t         size = cloth_sim_save_size(S.sim);
    const uint64_t       before = cloth_sim_hash(S.sim);
    const unsigned char  value = *byte;
    int                  good;
    CHECK(size <= sizeof buf && cloth_sim_save(S.sim, buf, size) == CLOTH_OK);
    *byte ^= 1;
    good = (cloth_sim_hash(S.sim) != before) == !(f->flags & CLOTHI_HANDLE);
    CHECK(cloth_sim_save(S.sim, again, size) == CLOTH_OK);
    good = good && memcmp(buf, again, size) != 0;
    good = good && cloth_sim_restore(S.sim, buf, size) == CLOTH_OK && *byte == value &&
           cloth_sim_hash(S.sim) == before;
    *byte = value;
    if (!(f->flags & CLOTHI_PARAM)) {       /* a step reads params through const pointers      */
        m->at = byte;
        good = good && cloth_step(S.sim, 0.008, NULL) == CLOTH_ERR_CANCELLED && *byte == value &&
               cloth_sim_hash(S.sim) == before;
        m->at = NULL;
        *byte = value;
    }
    if (!good) printf("  %s is not walked\n", f->name);
    CHECK(good);
}

static void every_field(void) {
    int kind, k;
    FOR_INTEGRATORS(kind) {
        cloth_report r;
        meddler      m;
        size_t       f, bytes = 0;
        S = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, (cloth_integrator)kind, NULL,
                       WITH_ALL);
        add_meddler(S.sim, &m);
        for (k = 0; k < 3; k++) CHECK(cloth_step(S.sim, 0.008, &r) == CLOTH_OK);
        for (f = 0; f < CLOTHI_FIELDS; f++) {
            const clothi_field *q = clothi_fields + f;
            if (!byte_of(q, 0)) continue;
            if (q->flags & CLOTHI_ARRAY) bytes += clothi_field_count(S.sim, q) * q->size;
            for (k = 0; k < 2; k++) field_is_walked(q, &m, byte_of(q, k));
        }
        CHECK(r.bytes.state >= bytes && r.bytes.state < 2 * bytes);
        CHECK(cloth_step(S.sim, 0.008, &r) == CLOTH_OK);    /* unharmed */
        scene_close(&S);
    }
}

/* --- replay --- */

typedef struct keeper {                     /* a tape of one step                              */
    cloth_step_record      r;
    unsigned char         *state;
    double                *x, *v;
    cloth_collide_contact *contact;
    int                    steps, substeps, good;
    double                 share;           /* where the last substep ended                    */
} keeper;

static void *copy_of(const void *data, size_t size) {
    void *p = malloc(size + 1);
    if (!p) exit(2);
    return size ? memcpy(p, data, size) : p;
}

static void keeper_free(keeper *k) {
    free(k->state);
    free(k->x);
    free(k->v);
    free(k->contact);
    memset(k, 0, sizeof *k);
}

static void keep_step(void *user, const cloth_step_record *r) {
    keeper      *k = (keeper *)user;
    const size_t bytes = 3 * (size_t)r->nv * sizeof(double);
    const int    steps = k->steps + 1, substeps = k->substeps, good = k->good;
    keeper_free(k);
    k->r = *r;
    k->r.state = k->state = (unsigned char *)copy_of(r->state, r->bytes);
    k->r.x = k->x = (double *)copy_of(r->x, bytes);
    k->r.v = k->v = (double *)copy_of(r->v, bytes);
    k->r.contact = k->contact =
        (cloth_collide_contact *)copy_of(r->contact, (size_t)r->ncontact * sizeof *r->contact);
    k->steps = steps, k->substeps = substeps, k->good = good;
}

#define FOLLOWER 8                          /* by a tie: it has no y of its own                */

/* y is made of the input alone, what is pinned reaches its goal, substeps follow each other. */
static void keep_substep(void *user, const cloth_step_input *in, const double *x) {
    keeper *k = (keeper *)user;
    int     i, n = 3 * S.nv;
    k->substeps = in->share[0] > 0 ? k->substeps + 1 : 1;
    k->good &= !(in->share[0] > 0) || !(fabs(in->share[0] - k->share) > 1e-12);
    k->share = in->y ? in->share[1] : in->share[1] + in->h / 0.008;
    for (i = 0; i < n; i++) {
        if (i / 3 == FOLLOWER) continue;
        if (in->y && in->pin[i / 3] >> (i % 3) & 1) k->good &= x[i] == in->goal[i];
        else if (in->y && in->x_prev && in->eta < in->h)
            k->good &= in->y[i] == (4 * in->x[i] - in->x_prev[i]) / 3 +
                                       2 * in->h / 9 * (4 * in->v[i] - in->v_prev[i]);
        else if (in->y)
            k->good &= in->y[i] == in->x[i] + in->h * in->v[i] && !(in->eta < in->h);
    }
    k->good &= in->y ? x != in->x : x == in->x;
}

static void listen(cloth_sim *sim, keeper *k) {
    cloth_recorder r;
    r.user = k;
    r.substep = keep_substep;
    r.step = keep_step;
    memset(k, 0, sizeof *k);
    k->good = 1;
    CHECK(cloth_sim_set_recorder(sim, &r) == CLOTH_OK);
}

/* Steps in which a pin, an attachment and the obstacles move; `way` 1: everything else changes. */
static void drive(cloth_sim *sim, cloth_collide *c, const cloth_obstacle *ball, int from, int n,
                  int way) {
    static const double g[3] = {2, -5, 1}, w[3] = {-2, 0, 4};
    cloth_attachment    id;
    int                 k, i;
    if (way) {
        static const double bary[3] = {0.5, 0.25, 0.25};
        CHECK(cloth_sim_set_gravity(sim, g) == CLOTH_OK && cloth_sim_set_wind(sim, w) == CLOTH_OK);
        CHECK(cloth_sim_unpin(sim, 0) == CLOTH_OK && cloth_sim_set_force(sim, NULL) == CLOTH_OK);
        CHECK(cloth_sim_attach(sim, 3, bary, 3, g, &id) == CLOTH_OK);
        if (c) CHECK(cloth_collide_set_friction(c, *ball, 0.9) == CLOTH_OK);
    }
    for (k = from; k < from + n; k++) {
        double to[3] = {0.2, 0.1, 0.2};
        to[0] += 0.004 * k * (way ? -1 : 1);
        CHECK(cloth_sim_pin(sim, 2, CLOTH_AXIS_X | CLOTH_AXIS_Z, to) == CLOTH_OK);
        to[1] = -0.12 - 0.001 * k;
        if (c) CHECK(cloth_collide_move(c, *ball, to) == CLOTH_OK);
        CHECK(cloth_step(sim, 0.008 * (1 + way), NULL) == CLOTH_OK);
    }
    if (way) CHECK(cloth_sim_set_wind(sim, NULL) == CLOTH_OK);
    for (i = 0; way && i < 9; i++) cloth_sim_state(sim)->v[i] += 0.1 * i;
    if (way) cloth_sim_state_changed(sim);
}

static void same_record(const cloth_step_record *p, const cloth_step_record *q) {
    const size_t bytes = 3 * (size_t)p->nv * sizeof(double);
    CHECK(p->bytes == q->bytes && memcmp(p->state, q->state, p->bytes) == 0);
    CHECK(memcmp(p->x, q->x, bytes) == 0 && memcmp(p->v, q->v, bytes) == 0);
    CHECK(p->outcome == q->outcome && p->ncontact == q->ncontact && !(p->h < q->h) &&
          !(p->h > q->h));
    CHECK(memcmp(p->contact, q->contact, (size_t)p->ncontact * sizeof *p->contact) == 0);
}

static cloth_collide *contact_of(cloth_sim *sim, cloth_obstacle *ball) {
    static const double ground[3] = {0, -0.3, 0}, center[3] = {0.2, -0.12, 0.2};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_collide      *c = NULL;
    CHECK(cloth_collide_create(sim, NULL, &c) == CLOTH_OK);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground;
    CHECK(cloth_collide_add(c, &o, ball) == CLOTH_OK);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = center, o.radius = 0.1;
    CHECK(cloth_collide_add(c, &o, ball) == CLOTH_OK);
    return c;
}

/* A step recorded, the sim driven elsewhere, the step replayed there and in a fresh sim. */
static void replayed(int kind, int contact, int substeps) {
    static const cloth_tie tie[1] = {{7, FOLLOWER, CLOTH_AXIS_X | CLOTH_AXIS_Y}};
    cloth_collide *c = NULL, *c2 = NULL;
    cloth_obstacle ball, ball2;
    cloth_sim     *fresh = NULL;
    cloth_report   report;
    keeper         first, again;
    meddler        m, m2;
    double         t;
    uint64_t       hash;
    scene_desc(&S, 6, NULL, WITH_ALL);
    S.desc.integrator = (cloth_integrator)kind;
    S.desc.substeps = kind == CLOTH_INTEGRATOR_LEAPFROG ? 0 : substeps;
    if (contact) S.desc.contact = CLOTH_CONTACT_SELF;
    if (kind != CLOTH_INTEGRATOR_LEAPFROG) S.desc.nties = 1, S.desc.ties = tie;
    CHECK(scene_open(&S, WITH_ALL) == CLOTH_OK);
    add_meddler(S.sim, &m);
    if (contact) c = contact_of(S.sim, &ball);
    drive(S.sim, c, &ball, 0, 12, 0);
    listen(S.sim, &first);
    drive(S.sim, c, &ball, 12, 1, 0);
    CHECK(first.steps == 1 && first.substeps > 0 && first.good);
    if (kind != CLOTH_INTEGRATOR_LEAPFROG) CHECK(first.substeps == substeps);
    if (contact && kind != CLOTH_INTEGRATOR_LEAPFROG) CHECK(first.r.ncontact > 0);
    CHECK(memcmp(first.x, cloth_sim_state(S.sim)->x, 24 * (size_t)S.nv) == 0);
    hash = cloth_sim_hash(S.sim);
    t = cloth_sim_state(S.sim)->t;
    CHECK(cloth_sim_set_recorder(S.sim, NULL) == CLOTH_OK);
    drive(S.sim, c, &ball, 13, 4, 1);
    CHECK(cloth_sim_hash(S.sim) != hash);
    listen(S.sim, &again);
    CHECK(cloth_step_replay(S.sim, &first.r, &report) == CLOTH_OK);
    CHECK(report.status == CLOTH_OK && cloth_sim_hash(S.sim) == hash);
    CHECK(!(cloth_sim_state(S.sim)->t < t) && !(cloth_sim_state(S.sim)->t > t));
    same_record(&first.r, &again.r);
    keeper_free(&again);
    CHECK(cloth_sim_create(S.model, &fresh) == CLOTH_OK);
    add_meddler(fresh, &m2);
    if (contact) c2 = contact_of(fresh, &ball2);
    listen(fresh, &again);
    CHECK(cloth_step_replay(fresh, &first.r, NULL) == CLOTH_OK && cloth_sim_hash(fresh) == hash);
    same_record(&first.r, &again.r);
    keeper_free(&again);
    keeper_free(&first);
    cloth_collide_destroy(c2);
    cloth_sim_destroy(fresh);
    cloth_collide_destroy(c);
    scene_close(&S);
}

/* A step of which contact lets half be taken: a plane would come through a sheet that is pinned and
 * goes up, a ball turns. Its record goes as far, and leaves as much of the way. */
static void shortened(int kind, int substeps) {
    static const double up[3] = {0, 0.15, 0}, down[3] = {0, -0.3, 0}, there[3] = {0, 0, 0.4};
    static const double turn[9] = {0, 0, 1, 0, 1, 0, -1, 0, 0};
    cloth_collide *c, *c2;
    cloth_obstacle ball, plane;
    cloth_sim     *fresh = NULL;
    keeper         first;
    double         to[3], t;
    uint64_t       hash;
    int            i;
    scene_desc(&S, 6, NULL, WITH_ALL);
    S.desc.integrator = (cloth_integrator)kind;
    S.desc.substeps = kind == CLOTH_INTEGRATOR_LEAPFROG ? 0 : substeps;
    S.desc.contact = CLOTH_CONTACT_SELF;
    CHECK(scene_open(&S, WITH_ALL) == CLOTH_OK && cloth_sim_create(S.model, &fresh) == CLOTH_OK);
    c = contact_of(S.sim, &ball), c2 = contact_of(fresh, &ball);
    plane.id = ball.id - 1;                 /* the slot before */
    CHECK(cloth_step(S.sim, 0.008, NULL) == CLOTH_OK);
    for (i = 0; i < S.nv; i++) {
        memcpy(to, cloth_sim_state(S.sim)->x + 3 * i, sizeof to);
        to[1] += 0.002;
        CHECK(cloth_sim_pin(S.sim, i, CLOTH_AXIS_ALL, to) == CLOTH_OK);
    }
    CHECK(cloth_collide_pose(c, ball, turn, there) == CLOTH_OK);
    CHECK(cloth_collide_move(c, plane, up) == CLOTH_OK);
    listen(S.sim, &first);
    t = cloth_sim_state(S.sim)->t;
    CHECK(cloth_collide_step(c, 0.008, 4, NULL) == CLOTH_OK);
    CHECK(cloth_collide_last(c).fraction < 1);
    CHECK_NEAR(cloth_sim_state(S.sim)->t, t + 0.008 * cloth_collide_last(c).fraction, 1e-15);
    CHECK(cloth_sim_set_recorder(S.sim, NULL) == CLOTH_OK);
    hash = cloth_sim_hash(S.sim);
    CHECK(cloth_step_replay(fresh, &first.r, NULL) == CLOTH_OK && cloth_sim_hash(fresh) == hash);
    CHECK(cloth_collide_move(c, plane, down) == CLOTH_OK && cloth_step(S.sim, 0.008, NULL) == 0);
    CHECK(cloth_collide_move(c2, plane, down) == CLOTH_OK && cloth_step(fresh, 0.008, NULL) == 0);
    CHECK(cloth_sim_hash(fresh) == cloth_sim_hash(S.sim));
    CHECK(cloth_step_replay(S.sim, &first.r, NULL) == CLOTH_OK && cloth_sim_hash(S.sim) == hash);
    keeper_free(&first);
    cloth_collide_destroy(c), cloth_collide_destroy(c2);
    cloth_sim_destroy(fresh);
    scene_close(&S);
}

static void steps_replay(void) {
    int kind;
    FOR_INTEGRATORS(kind) {
        replayed(kind, 0, 1);
        replayed(kind, 0, 3);
        replayed(kind, 1, 1);
        replayed(kind, 1, 2);
        shortened(kind, 1);
        shortened(kind, 2);
    }
}

static void statics_replay(void) {
    static const double H[4] = {NAN, -0.01, INFINITY, 0};
    keeper              first, again;
    uint64_t            hash;
    int                 i;
    S = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, NULL,
                   WITH_ALL & ~WITH_WIND);
    listen(S.sim, &first);
    CHECK(cloth_solve_static(S.sim, NULL) == CLOTH_OK && first.steps == 1);
    CHECK(!(first.r.h > 0) && first.substeps == 1);
    hash = cloth_sim_hash(S.sim);
    CHECK(cloth_sim_set_recorder(S.sim, NULL) == CLOTH_OK);
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK && cloth_sim_hash(S.sim) != hash);
    listen(S.sim, &again);
    CHECK(cloth_step_replay(S.sim, &first.r, NULL) == CLOTH_OK && cloth_sim_hash(S.sim) == hash);
    same_record(&first.r, &again.r);
    for (i = 0; i < 4; i++) {               /* a record that is none runs nothing */
        cloth_step_record bad = first.r;
        bad.h = H[i];
        if (i == 3) bad.state = NULL;
        CHECK(cloth_step_replay(S.sim, &bad, NULL) == CLOTH_ERR_ARGUMENT);
        CHECK(cloth_sim_hash(S.sim) == hash);
    }
    keeper_free(&first);
    keeper_free(&again);
    scene_close(&S);
}

/* A replayed step begins with the energies of its record, not with those that the sim kept of the
 * step before: the second one has another gravity. */
static void replayed_energies(void) {
    static const double g[3] = {0, -20, 1};
    keeper              first, second;
    cloth_report        r, again;
    S = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, NULL,
                   WITH_PINS);
    listen(S.sim, &first);
    CHECK(cloth_step(S.sim, 0.008, NULL) == CLOTH_OK);
    listen(S.sim, &second);
    CHECK(cloth_sim_set_gravity(S.sim, g) == CLOTH_OK);
    CHECK(cloth_step(S.sim, 0.008, &r) == CLOTH_OK);
    CHECK(cloth_sim_set_recorder(S.sim, NULL) == CLOTH_OK);
    CHECK(cloth_step_replay(S.sim, &first.r, &again) == CLOTH_OK);
    CHECK(cloth_step_replay(S.sim, &second.r, &again) == CLOTH_OK);
    CHECK(memcmp(&r.energy, &again.energy, sizeof r.energy) == 0);
    keeper_free(&first);
    keeper_free(&second);
    scene_close(&S);
}

/* --- refusals --- */

static int said(cloth_status status, const char *what, uint64_t before) {
    const int good = status == CLOTH_ERR_FORMAT && told.errors == 1 &&
                     strstr(told.text, what) && cloth_sim_hash(S.sim) == before;
    if (!good) printf("  status %d, wanted %s, said: %s\n", (int)status, what, told.text);
    host_forget(&told);
    return good;
}

/* Where a field begins in a snapshot. */
static size_t place_of(const char *name, int within) {
    size_t f, at = sizeof(clothi_snapshot_head);
    for (f = 0; f < CLOTHI_FIELDS; f++) {
        const clothi_field *q = clothi_fields + f;
        if (strcmp(q->name, name) == 0 && (q->within > 0) == within) return at;
        at += (clothi_field_count(S.sim, q) * q->size + 7) / 8 * 8;
    }
    printf("  no field %s\n", name);
    exit(2);
}

static void forged(unsigned char *buf, size_t at, const void *value, size_t size,
                   const char *what) {
    const uint64_t       before = cloth_sim_hash(S.sim);
    clothi_snapshot_head head;
    unsigned char        was[8];
    memcpy(was, buf + at, size);
    memcpy(buf + at, value, size);
    memcpy(&head, buf, sizeof head);
    head.checksum = clothi_hash(0xcbf29ce484222325u, buf + sizeof head,
                                (size_t)head.bytes - sizeof head);
    memcpy(buf, &head, sizeof head);
    CHECK(said(cloth_sim_restore(S.sim, buf, (size_t)head.bytes), what, before));
    memcpy(buf + at, was, size);
}

/* With its checksum right: only a check of the field itself can tell. */
static void forged_fields(void) {
    static unsigned char buf[1 << 17];
    const double         bad = NAN, below = -1, nothing = 0;
    const int            two = 2, minus = -1, below2 = -2, stitch[2] = {-1, 1 << 20};
    const unsigned char  axes = 9;
    const size_t         face = offsetof(cloth_step_attachment, face);
    cloth_hooks          hooks = host_hooks(&told);
    double               to[3];
    int                  most;
    memset(&told, 0, sizeof told);
    S = scene_make(5, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_BDF2, &hooks,
                   WITH_ALL);
    cloth_sim_params(S.sim)->mass_given = 1;
    CHECK(cloth_sim_params_changed(S.sim) == CLOTH_OK);
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK && cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    most = S.mesh->nf;
    host_forget(&told);
    forged(buf, place_of("attach", 0) + face, &most, sizeof most, "attachment");
    forged(buf, place_of("attach", 0) + face, &minus, sizeof minus, "attachment");
    forged(buf, place_of("attach", 0), &two, sizeof two, "attachment");
    forged(buf, place_of("attach", 0) + offsetof(cloth_step_attachment, k), &bad, 8, "attachment");
    forged(buf, place_of("attach", 0) + offsetof(cloth_step_attachment, pose), &bad, 8,
           "attachment");
    forged(buf, place_of("attach", 0) + offsetof(cloth_step_attachment, at), &bad, 8,
           "attachment");
    forged(buf, place_of("attach", 0) + offsetof(cloth_step_attachment, other), &minus,
           sizeof minus, "attachment");
    forged(buf, place_of("attach", 0) + offsetof(cloth_step_attachment, on), stitch,
           sizeof stitch, "attachment");
    forged(buf, place_of("attach", 0) + offsetof(cloth_step_attachment, on), &below2,
           sizeof below2, "attachment");
    forged(buf, place_of("nattach", 0), &two, sizeof two, "nattach");
    forged(buf, place_of("history", 0), &two, sizeof two, "history");
    forged(buf, place_of("h_prev", 0), &below, 8, "h_prev");
    forged(buf, place_of("x_prev", 0) + 16, &bad, 8, "x_prev");
    forged(buf, place_of("v_prev", 0) + 16, &bad, 8, "v_prev");
    forged(buf, place_of("pin", 0) + 3, &axes, 1, "pin");
    forged(buf, place_of("force", 0), &bad, 8, "force");
    forged(buf, place_of("force_on", 0), &minus, sizeof minus, "force_on");
    forged(buf, place_of("gravity", 0), &bad, 8, "gravity");
    forged(buf, place_of("wind", 0) + 8, &bad, 8, "wind");
    forged(buf, place_of("params.material", 0), &below, 8, "density");
    forged(buf, place_of("params.material", 1), &two, sizeof two, "plane");
    forged(buf, place_of("params.hinge_scale", 0), &below, 8, "hinge_scale");
    forged(buf, place_of("params.theta0", 0), &bad, 8, "theta0");
    forged(buf, place_of("params.X", 0), &bad, 8, "params.X");
    forged(buf, place_of("params.mass", 0), &nothing, 8, "mass");
    {
        clothi_snapshot_head head;          /* and as it was it is good                        */
        memcpy(&head, buf, sizeof head);
        head.checksum = clothi_hash(0xcbf29ce484222325u, buf + sizeof head,
                                    (size_t)head.bytes - sizeof head);
        memcpy(buf, &head, sizeof head);
        CHECK(cloth_sim_restore(S.sim, buf, sizeof buf) == CLOTH_OK);
    }
    memcpy(to, cloth_sim_state(S.sim)->x, sizeof to);
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    scene_close(&S);
    CHECK(told.live == 0);
}

/* Each aspect of the model, named. */
static void another_model_is_named(void) {
    static const char *const aspect[] = {"ties", "parts", "contact rung", "start", "start",
                                         "start", "integrator", "regions", "rest shape",
                                         "tolerances", "air", "mesh"};
    static unsigned char     buf[1 << 17];
    static const cloth_tie   tie[1] = {{7, 8, CLOTH_AXIS_X}};
    static int               other[64];
    cloth_material           two[2];
    cloth_hooks              hooks = host_hooks(&told);
    int                      k;
    other[3] = 1;
    two[0] = two[1] = cloth_material_default();
    for (k = 0; k < 12; k++) {
        double *x;
        int     i;
        memset(&told, 0, sizeof told);
        S = scene_make(4, CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, &hooks,
                       0);
        CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
        scene_close(&S);
        scene_desc(&S, k == 11 ? 5 : 4, &hooks, 0);
        S.start = x = (double *)malloc(3 * (size_t)S.nv * sizeof(double));
        if (!x) exit(2);
        for (i = 0; i < 3 * S.nv; i++) x[i] = S.mesh->x[i] + (i == 4 ? 1e-9 : 0);
        if (k == 0) S.desc.nties = 1, S.desc.ties = tie;
        if (k == 1) S.desc.part = other;
        if (k == 2) S.desc.contact = CLOTH_CONTACT_SELF;
        if (k == 3) S.desc.x = x;
        if (k == 4) S.desc.v = x;
        if (k == 5) S.desc.gravity[0] = 1;
        if (k == 6) S.desc.integrator = CLOTH_INTEGRATOR_BDF2;
        if (k == 7) S.desc.region = other, S.desc.nregions = 2, S.desc.materials = two;
        if (k == 8) S.desc.x_rest = x, S.desc.x = S.mesh->x;
        if (k == 9) S.desc.cg_tolerance *= 0.5;
        if (k == 10) S.desc.drag = 0.7;
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        host_forget(&told);
        CHECK(said(cloth_sim_restore(S.sim, buf, sizeof buf), aspect[k], cloth_sim_hash(S.sim)));
        scene_close(&S);
    }
}

/* What decides the course of a sim is in the hash of its model, word by word: of all these models
 * no two have the same, the same desc has it again, and a snapshot of the plain one is refused. */
static void every_word_counts(void) {
    enum { WORDS = 34 };
    static unsigned char   buf[1 << 17];
    static const cloth_tie tie[2] = {{7, 8, CLOTH_AXIS_X}, {7, 8, CLOTH_AXIS_Y}};
    static const cloth_pin pin[2] = {{3, CLOTH_AXIS_X}, {3, CLOTH_AXIS_Y}};
    static int             other[64];
    cloth_material         two[2];
    uint64_t               hash[WORDS];
    int                    k, i;
    other[3] = 1;
    two[0] = two[1] = cloth_material_default();
    for (k = 0; k < WORDS; k++) {
        cloth_desc *d = &S.desc;
        cloth_hooks hooks = host_hooks(&told);
        double     *x, X[6 * 64], mass[64];
        scene_desc(&S, 4, &hooks, 0);
        S.start = x = (double *)malloc(3 * (size_t)S.nv * sizeof(double));
        if (!x) exit(2);
        for (i = 0; i < 3 * S.nv; i++) x[i] = S.mesh->x[i] + (i == 4 ? 1e-9 : 0);
        CHECK(cloth_flatten(S.nv, S.mesh->x, S.mesh->nf, S.mesh->faces, X) == CLOTH_OK);
        X[4] += 1e-9;
        for (i = 0; i < 64; i++) mass[i] = 1;
        switch (k) {                        /* 0 and 1: as it is                               */
        case 2: d->nties = 1, d->ties = tie; break;
        case 3: d->nties = 1, d->ties = tie + 1; break;
        case 4: d->npins = 1, d->pins = pin; break;
        case 5: d->npins = 1, d->pins = pin + 1; break;
        case 6: d->membrane = CLOTH_MEMBRANE_SPRINGS; break;
        case 7: d->bend = CLOTH_BEND_QUADRATIC; break;
        case 8: d->bend = CLOTH_BEND_NONE; break;
        case 9: d->integrator = CLOTH_INTEGRATOR_BDF2; break;
        case 10: d->integrator = CLOTH_INTEGRATOR_LEAPFROG; break;
        case 11: d->contact = CLOTH_CONTACT_OBSTACLES; break;
        case 12: d->contact = CLOTH_CONTACT_SELF; break;
        case 13: d->x = x; break;
        case 14: d->v = x; break;
        case 15: d->x_rest = x, d->x = S.mesh->x; break;
        case 16: d->X = X; break;
        case 17: d->part = other; break;
        case 18: d->region = other, d->nregions = 2, d->materials = two; break;
        case 19: d->nregions = 2, d->materials = two; break;
        case 20: d->wind_on = 1; break;
        case 21: d->wind_on = 1, d->wind[2] = 1; break;
        case 22: d->gravity[0] = 1; break;
        case 23: d->substeps = 2; break;
        case 24: d->max_newton = 2; break;
        case 25: d->max_attachments = 2; break;
        case 26: d->linear = CLOTH_LINEAR_SGS; break;
        case 27: d->tolerance *= 2; break;
        case 28: d->sleep = 2; break;
        case 29: d->air_density *= 2; break;
        case 30: d->vertex_mass = mass; break;
        case 31: d->material.density *= 2; break;
        case 32: d->material.plane = CLOTH_PLANE_STRAIN_3D; break;
        case 33: d->rest_angle = CLOTH_REST_ANGLE_FLAT; break;
        default: break;
        }
        CHECK(scene_open(&S, 0) == CLOTH_OK);
        hash[k] = cloth_model_hash(S.model);
        for (i = 0; i < k; i++)
            if (!CHECK((hash[i] == hash[k]) == (i == 0 && k == 1))) printf("  %d, %d\n", i, k);
        if (k == 0) CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
        host_forget(&told);
        if (k > 1)
            CHECK(said(cloth_sim_restore(S.sim, buf, sizeof buf), "of another model",
                       cloth_sim_hash(S.sim)));
        scene_close(&S);
    }
}

/* Snapshot and record of a sim with contact, refused by one whose contact differs. */
static void another_contact_is_refused(void) {
    static unsigned char buf[1 << 17];
    cloth_hooks          hooks = host_hooks(&told);
    keeper               kept;
    int                  k;
    memset(&kept, 0, sizeof kept);
    memset(&told, 0, sizeof told);
    scene_desc(&S, 5, &hooks, 0);
    S.desc.contact = CLOTH_CONTACT_SELF;
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    for (k = 0; k < 5; k++) {
        cloth_collide_desc d = cloth_collide_desc_default();
        cloth_collide_part part = {1, 1, 0xffffffffu, 0.4};
        cloth_sim         *sim = S.sim;
        cloth_collide     *c = NULL;
        if (k > 0) CHECK(cloth_sim_create(S.model, &sim) == CLOTH_OK);
        if (k == 1) d.initial = CLOTH_INITIAL_EXEMPT;
        if (k == 2) d.max_passes = 7;
        if (k == 3) d.nparts = 1, d.parts = &part;
        if (k < 4) CHECK(cloth_collide_create(sim, &d, &c) == CLOTH_OK);
        if (k == 0) {
            listen(sim, &kept);
            CHECK(cloth_step(sim, 0.01, NULL) == CLOTH_OK && kept.steps == 1);
            CHECK(cloth_sim_save(sim, buf, sizeof buf) == CLOTH_OK);
        } else {
            const uint64_t before = cloth_sim_hash(sim);
            host_forget(&told);
            CHECK(cloth_sim_restore(sim, buf, sizeof buf) == CLOTH_ERR_FORMAT && told.errors == 1);
            CHECK(cloth_step_replay(sim, &kept.r, NULL) == CLOTH_ERR_FORMAT && told.errors == 2);
            CHECK(cloth_sim_hash(sim) == before);
        }
        cloth_collide_destroy(c);
        if (k > 0) cloth_sim_destroy(sim);
    }
    keeper_free(&kept);
    scene_close(&S);
    CHECK(told.live == 0);
}

/* An allocator that fails leaves a restore, a replay and a recorded step where they began. */
static void out_of_memory(void) {
    static unsigned char buf[1 << 18];
    cloth_hooks          hooks = host_hooks(&told);
    cloth_obstacle       ball;
    cloth_collide       *c;
    keeper               kept, again;
    int                  what, fail, done;
    memset(&told, 0, sizeof told);
    scene_desc(&S, 6, &hooks, WITH_ALL);
    S.desc.contact = CLOTH_CONTACT_SELF;
    S.desc.integrator = CLOTH_INTEGRATOR_BDF2;
    CHECK(scene_open(&S, WITH_ALL) == CLOTH_OK);
    c = contact_of(S.sim, &ball);
    drive(S.sim, c, &ball, 0, 12, 0);
    CHECK(cloth_sim_save_size(S.sim) <= sizeof buf);
    CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
    listen(S.sim, &kept);
    drive(S.sim, c, &ball, 12, 1, 0);
    CHECK(kept.r.ncontact > 0);
    for (what = 0; what < 3; what++)
        for (fail = 1, done = 0; !done && fail < 400; fail++) {
            cloth_sim     *sim = NULL;
            cloth_collide *k;
            cloth_status   status;
            uint64_t       before;
            CHECK(cloth_sim_create(S.model, &sim) == CLOTH_OK);
            k = contact_of(sim, &ball);
            listen(sim, &again);
            if (what == 2) CHECK(cloth_sim_restore(sim, buf, sizeof buf) == CLOTH_OK);
            before = cloth_sim_hash(sim);
            told.calls = 0, told.fail_at = fail;
            status = what == 0   ? cloth_sim_restore(sim, buf, sizeof buf)
                     : what == 1 ? cloth_step_replay(sim, &kept.r, NULL)
                                 : cloth_step(sim, 0.008, NULL);
            told.fail_at = 0;
            done = status == CLOTH_OK;
            CHECK(done || status == CLOTH_ERR_MEMORY);
            if (!done && what != 1) CHECK(cloth_sim_hash(sim) == before);
            CHECK(done == (cloth_sim_hash(sim) != before) || what == 1);
            CHECK(again.steps == (done && what > 0));
            if (done && what == 1) same_record(&kept.r, &again.r);
            keeper_free(&again);
            cloth_collide_destroy(k);
            cloth_sim_destroy(sim);
        }
    CHECK(fail > 3);
    keeper_free(&kept);
    cloth_collide_destroy(c);
    scene_close(&S);
    CHECK(told.live == 0);
}

/* What is refused leaves the hash. */
static void refused_adds(void) {
    static const double third[3] = {0.3, 0.3, 0.4}, high[3] = {0, 0.1, 0};
    static const double off[3] = {0.3, 0.3, 0.3}, far[3] = {NAN, 0, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_collide_desc  d = cloth_collide_desc_default();
    cloth_hooks         hooks = host_hooks(&told);
    cloth_attachment    id;
    cloth_obstacle      slot;
    cloth_collide      *c = NULL, *more = NULL;
    cloth_term          t;
    keeper              kept;
    double              at[3], f[75];
    uint64_t            hash;
    int                 i;
    memset(&told, 0, sizeof told);
    scene_desc(&S, 5, &hooks, 0);
    S.desc.contact = CLOTH_CONTACT_SELF;
    S.desc.max_attachments = 1;
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    hash = cloth_sim_hash(S.sim);
    d.thickness = -1;
    CHECK(cloth_collide_create(S.sim, &d, &c) != CLOTH_OK && cloth_sim_hash(S.sim) == hash);
    CHECK(cloth_collide_create(S.sim, NULL, &c) == CLOTH_OK);
    CHECK(cloth_sim_attach(S.sim, 1, third, 2, high, &id) == CLOTH_OK);
    CHECK(cloth_step(S.sim, 0.01, NULL) == CLOTH_OK);
    hash = cloth_sim_hash(S.sim);
    CHECK(cloth_collide_create(S.sim, NULL, &more) != CLOTH_OK && !more);
    memset(&t, 0, sizeof t);
    CHECK(cloth_sim_add_term(S.sim, &t) == CLOTH_ERR_ARGUMENT);
    t.eval = meddler_eval, t.save = meddler_save;
    CHECK(cloth_sim_add_term(S.sim, &t) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_attach(S.sim, 1, third, 2, high, &id) == CLOTH_ERR_CAPACITY);
    CHECK(cloth_sim_attach(S.sim, 1 << 20, third, 2, high, &id) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_attach(S.sim, 1, off, 2, high, &id) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_set_gravity(S.sim, far) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_set_wind(S.sim, far) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_pin(S.sim, 1, 1, far) == CLOTH_ERR_NONFINITE);
    for (i = 0; i < 3 * S.nv && i < 75; i++) f[i] = NAN;
    CHECK(cloth_sim_set_force(S.sim, f) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_hash(S.sim) == hash);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0.05;
    memcpy(at, cloth_sim_state(S.sim)->x + 36, sizeof at);
    o.x = at;                               /* cloth goes through it: refused                  */
    CHECK(cloth_collide_add(c, &o, &slot) == CLOTH_ERR_MESH && cloth_sim_hash(S.sim) == hash);
    o.x = far;
    CHECK(cloth_collide_add(c, &o, &slot) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_sim_hash(S.sim) == hash);
    memset(&kept, 0, sizeof kept);
    CHECK(cloth_step_replay(S.sim, &kept.r, NULL) == CLOTH_ERR_FORMAT);
    CHECK(cloth_step_replay(S.sim, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_step_replay(NULL, &kept.r, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_set_recorder(NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_hash(S.sim) == hash);
    at[1] += 9;
    o.x = at;                               /* its slot's first: a sim without refusals has it */
    CHECK(cloth_collide_add(c, &o, &slot) == CLOTH_OK && slot.id >> 32 == 1);
    cloth_collide_destroy(c);
    scene_close(&S);
    CHECK(told.live == 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(every_field);
    RUN(steps_replay);
    RUN(statics_replay);
    RUN(replayed_energies);
    RUN(forged_fields);
    RUN(another_model_is_named);
    RUN(every_word_counts);
    RUN(another_contact_is_refused);
    RUN(refused_adds);
    RUN(out_of_memory);
    return TEST_END();
}
