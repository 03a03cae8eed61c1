/* fuzz_host.c - random bytes as the calls of a host: two sims of one model, with contact or not.
 *   clang -g -O1 -ffp-contract=off -fsanitize=fuzzer,address,undefined -DCLOTHSIM_IMPLEMENTATION \
 *       -I.. fuzz_host.c -o fuzz_host -lm
 *   ./fuzz_host -max_total_time=600 -max_len=1024 -len_control=0 corpus/
 * Without libFuzzer, files are replayed, or random bytes tried for N seconds from a seed:
 *   cc -std=c99 -g -O1 -ffp-contract=off -fsanitize=address,undefined -DFUZZ_MAIN \
 *       -DCLOTHSIM_IMPLEMENTATION -I.. fuzz_host.c -o fuzz_host -lm
 *   ./fuzz_host file ...        ./fuzz_host -N [seed]
 * test_host.c runs it in the suite. An input is a head and slices of FUZZ_SLICE bytes, a call each.
 * Aborts when a promise is broken: a call that failed and changed a hash, or said nothing; a NaN
 * that was taken; an accepted step with a number that is not finite, a pin beside its target, faces
 * that intersect and are not exempt, energy without work, other bytes than the allocator's; a
 * restore with another hash or another next step. A second run has all over again without what
 * failed, what only asked and what a restore undid, with other workers, other bytes in fresh memory
 * and no reports: each call ends with the hash that it had. */
#include "clothsim_collide.h"
#include "fuzz_host.h"

/* how: 0 cloth_step, 1 cloth_collide_step, 2 statics */
static cloth_status take(world *w, fuzz_body *b, int how, int halvings, double h, cloth_report *r) {
    w->asked = 0;
    return how == 0 ? cloth_step(b->sim, h, r) : how == 2 ? cloth_solve_static(b->sim, r)
         : cloth_collide_step(b->c, h, halvings, r);
}

/* Of one step in four back and there again: the same bits. */
static fate call_step(world *w, fuzz_body *b, bytes *d) {
    static const double sizes[] = {0, -0.01, HOST_NAN, HOST_INFINITY, 1e-9, 1e3, 1e300, 5e-324};
    const int      arm = w->h.fail_at ? w->h.fail_at - w->h.calls : 0;
    const unsigned kind = next(d) % 16u, again = next(d) % 4u, k = next(d);
    const double   h = k < 60 ? 0.016 : k < 220 ? 0.01 : k < 232 ? 0.002 : sizes[k % 8];
    const int      how = kind == 15 ? 2 : kind > 11 && b->c ? 1 : 0, halvings = choice(d, 3);
    const size_t   size = again || w->second ? 0 : cloth_sim_save_size(b->sim);
    void          *buf = malloc(size + 1);
    cloth_ledger   was;
    cloth_report   r;
    cloth_status   status;
    fate           f;
    int            calls;
    w->h.fail_at = 0;
    if (!w->second && cloth_sim_energy(b->sim, &was)) was.attach = 1;     /* beyond a double */
    if (size) require(buf && cloth_sim_save(b->sim, buf, size) == CLOTH_OK);
    memcpy(w->v0, cloth_sim_state(b->sim)->v, 3 * sizeof(double) * (size_t)w->mesh->nv);
    host_forget(&w->h);
    calls = w->h.calls, w->h.fail_at = arm ? calls + arm : 0;
    status = take(w, b, how, halvings, h, w->second ? NULL : &r);
    if (how == 1 && !status) host_forget(&w->h);            /* what the longer steps said */
    f = judge(w, b, status);
    require(w->second || r.status == status);
    if (f == DONE && !w->second) {
        require(how == 2 || (h > 0 && finite_number(h)));
        require(b->old || r.bytes.total == w->bytes[0] + w->bytes[w->account]);
        require(how == 1 || r.counts.allocations == w->h.calls - calls);
        check_step(w, b, &r, &was, how == 0);
    }
    if (size && w->answer != 2) {
        const uint64_t after = cloth_sim_hash(b->sim);
        w->patience = 1000000;
        require(cloth_sim_restore(b->sim, buf, size) == CLOTH_OK);
        require(cloth_sim_hash(b->sim) == w->before);
        require(f || take(w, b, how, halvings, h, &r) == CLOTH_OK);
        require(cloth_sim_hash(b->sim) == after);
    }
    free(buf);
    return f;
}

static fate call_pin(world *w, fuzz_body *b, bytes *d) {
    const int      nv = w->mesh->nv, v = choice(d, nv), off = v < 0 || v >= nv;
    const unsigned how = next(d) % 4u, axes = how == 3 ? next(d) : 1 + next(d) % 7u;
    const double  *x = cloth_sim_state(b->sim)->x + (off ? 0 : 3 * v);
    double         to[3];
    fate           f;
    int            k;
    numbers(w, d, 3, 0.1, to);
    for (k = 0; k < 3; k++) to[k] = how == 1 ? x[k] : to[k] + x[k];
    f = judge(w, b, how ? cloth_sim_pin(b->sim, v, axes, how == 1 ? NULL : to)
                        : cloth_sim_unpin(b->sim, v));
    require(!off || f == FAILED);
    for (k = 0; k < 3 && !f; k++)
        if (axes >> k & 1) b->k.goal[3 * v + k] = to[k];
    if (!f) b->k.pin[v] = how ? b->k.pin[v] | axes : 0;
    return f;
}

static fate call_attach(world *w, fuzz_body *b, bytes *d) {
    const unsigned   slot = next(d) % FUZZ_THINGS, how = next(d) % 6u;
    const int        face = choice(d, w->mesh->nf), other = choice(d, w->mesh->nf);
    const double     k = next(d) < 200 ? 10 * next(d) : number(w, d);
    cloth_attachment id = b->k.tie[slot];
    double           bary[3], to[3];
    fate             f;
    numbers(w, d, 3, 1, to), numbers(w, d, 2, 1, bary);
    bary[2] = 1 - bary[0] - bary[1];
    if (how > 3) to[2] = 1 - to[0] - to[1], w->odd = 0;
    if (how == 0) return judge(w, b, cloth_sim_detach(b->sim, id));
    if (how == 1) return judge(w, b, cloth_sim_attach_move(b->sim, id, to));
    if (how == 5 && !b->c) return ASKED;
    f = judge_all(w, b, how < 4 ? cloth_sim_attach(b->sim, face, bary, k, to, &id)
                      : how == 4 ? cloth_sim_stitch(b->sim, face, bary, k, other, to, &id)
                      : cloth_collide_attach(b->c, b->id[slot], other, to, face, bary, k, &id));
    require((f == DONE) == (id.id != 0));
    if (!f) b->k.tie[slot] = id;
    return f;
}

/* Gravity, wind, forces; or one number of the params, which is put back where it is refused. */
static fate call_set(world *w, fuzz_body *b, bytes *d) {
    const unsigned how = next(d) % 10u, at = next(d), off = next(d) % 5u == 0;
    cloth_params  *p = cloth_sim_params(b->sim);
    double         f[3 * FUZZ_V], g[3], *q, old;
    fate           fate_;
    int            i;
    require((p == NULL) == w->hit);
    if (!p || p->nh == 0) return ASKED;
    if (how < 3) {
        numbers(w, d, 3, how == 0 ? 40 : how == 1 ? 20 : 0.1, g);
        for (i = 0; i < 3 * w->mesh->nv; i++) f[i] = g[i % 3];
        if (off && how) w->odd = 0;
        return judge_all(w, b, how == 0 ? cloth_sim_set_gravity(b->sim, g)
                             : how == 1 ? cloth_sim_set_wind(b->sim, off ? NULL : g)
                                        : cloth_sim_set_force(b->sim, off ? NULL : f));
    }
    q = how == 3 ? p->hinge_scale + at % (unsigned)p->nh
      : how == 4 ? p->theta0 + at % (unsigned)p->nh : how == 5 ? p->X + at % (unsigned)(6 * p->nf)
      : how == 6 ? p->mass + at % (unsigned)p->nv : &p->material->density + at % 7u;
    old = *q, i = p->mass_given;
    *q = next(d) < 128 ? old * (0.9 + next(d) / 1000.0) : number(w, d);
    p->mass_given = how == 6;
    fate_ = judge_all(w, b, cloth_sim_params_changed(b->sim));
    if (fate_) *q = old, p->mass_given = i;
    return fate_;
}

/* Mostly under the sheet, so that it lands there. */
static fate call_add(world *w, fuzz_body *b, bytes *d) {
    const unsigned      at = next(d) % FUZZ_THINGS, kind = 2 + next(d) % 4u, thick = next(d);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double              center[3], half[3], *x = b->k.x[at];
    cloth_obstacle      id;
    fate                f;
    int                 i;
    if (!b->c || b->id[at].id) return ASKED;
    numbers(w, d, 3, 1, center), numbers(w, d, 3, 0.3, half);
    for (i = 0; i < 3; i++) center[i] += 0.15, half[i] = 0.01 + fabs(half[i]);
    if (thick % 8u) center[1] = -0.003 - 0.1 * fabs(center[1]) - (kind == 4 ? 0 : half[1]);
    cloth_obstacle_box(center, half, NULL, x);
    for (i = 0; i < 6 && kind < 5; i++) x[i] = center[i % 3] + (i == 3 || i == 5 ? half[i % 3] : 0);
    o.kind = (cloth_obstacle_kind)kind, o.x = x, o.radius = half[1];
    o.normal[0] = 0.2 * half[0], o.normal[1] = 1;
    if (thick > 120) o.thickness = fabs(number(w, d));
    if (thick > 200) o.friction = fabs(number(w, d));
    f = judge(w, b, cloth_collide_add(b->c, &o, &id));
    require((f == DONE) == (id.id != 0));
    if (!f) b->id[at] = id, b->layout++;
    return f;
}

static fate call_obstacle(world *w, fuzz_body *b, bytes *d) {
    const unsigned       at = next(d) % FUZZ_THINGS, how = next(d) % 10u;
    const cloth_obstacle id = b->id[at];
    double               x[24], by[6], R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    fate                 f;
    int                  i;
    if (!b->c) return ASKED;
    numbers(w, d, 3, how == 4 ? 0.4 : 0.06, by), numbers(w, d, 3, 1, by + 3);
    for (i = 0; i < 24; i++) x[i] = b->k.x[at][i] + by[i % 3];
    R[0] = R[8] = cos(by[3]), R[2] = sin(by[3]), R[6] = -R[2];
    f = judge(w, b, how < 4 ? cloth_collide_move(b->c, id, x)
                  : how == 4 ? cloth_collide_teleport(b->c, id, x)
                  : how == 5 ? cloth_collide_pose(b->c, id, R, by)
                  : how == 6 ? cloth_collide_set_friction(b->c, id, by[4])
                  : how == 7 ? cloth_collide_set_surface(b->c, id, by, by + 3)
                  : how == 8 ? cloth_collide_remove(b->c, id)
                  : cloth_collide_untangle(b->c, by[0] > 0 ? by[0] : 0, NULL));
    require(how == 9 || id.id || f == FAILED);
    if (!f && how < 5) memcpy(b->k.x[at], x, sizeof x);
    if (!f && how == 8) b->id[at].id = 0, b->layout++;
    return f;
}

static fate call_save(world *w, fuzz_body *b, bytes *d) {
    (void)d;
    w->h.fail_at = 0;
    free(b->kept);
    b->kept_size = cloth_sim_save_size(b->sim), b->kept = malloc(b->kept_size);
    require(b->kept && cloth_sim_save(b->sim, b->kept, b->kept_size) == CLOTH_OK);
    b->kept_hash = w->before, b->kept_k = b->k;
    b->kept_at = w->at, b->kept_layout = b->layout;
    return DONE;
}

/* The body's own snapshot, or the other's; or a damaged one. */
static fate call_restore(world *w, fuzz_body *b, bytes *d) {
    const unsigned how = next(d), at = next(d) * 256u + next(d), bits = 1 + next(d) % 255u;
    fuzz_body     *from = how > 200 ? w->body + (b == w->body) : b;
    const int      undoes = from == b && b->layout == b->kept_layout;
    unsigned char *p = (unsigned char *)from->kept;
    fate           f;
    int            i;
    if (!p) return ASKED;
    p += at % from->kept_size;
    if (how < 30) *p = (unsigned char)(*p ^ bits);
    f = judge(w, b, cloth_sim_restore(b->sim, from->kept, from->kept_size));
    if (how < 30) *p = (unsigned char)(*p ^ bits);
    require(how < 30 ? f == FAILED : !undoes || !f || w->hit);
    if (f) return f;
    require(cloth_sim_hash(b->sim) == from->kept_hash);
    for (i = b->kept_at + 1; i < w->at && undoes && !w->second; i++)
        w->idle[i] |= w->whose[i] == (int)(b - w->body);
    b->k = from->kept_k;
    return DONE;
}

static fate call_ask(world *w, fuzz_body *b, bytes *d) {
    cloth_collide_contact contact[8];
    cloth_collide_pair    pair[8];
    double                f[3 * FUZZ_V], g[3 * FUZZ_V], o[6], t;
    int                   n, pairs[16], max = (int)(next(d) % 10u) - 1;
    numbers(w, d, 6, 1, o);
    (void)cloth_sim_potential(b->sim, cloth_sim_state(b->sim)->x, &t, f);
    (void)cloth_sim_ray(b->sim, o, o + 3, &t, &n, g);
    if (!b->c) return ASKED;
    (void)cloth_collide_contacts(b->c, max, contact, &n);
    (void)cloth_collide_failed(b->c, max, pair, &n);
    (void)cloth_collide_intersections(b->c, max, pairs, &n);
    (void)cloth_collide_forces(b->c, f);
    (void)cloth_collide_gap(b->c, o[0], &t);
    (void)cloth_collide_wrench(b->c, b->id[0], o, f, g);
    return ASKED;
}

/* A coordinate, a speed, or all speeds: the sheet turns, or folds. */
static fate call_write(world *w, fuzz_body *b, bytes *d) {
    cloth_state   *s = cloth_sim_state(b->sim);
    const unsigned n = 3 * (unsigned)w->mesh->nv, at = next(d) % n, how = next(d) % 8u;
    double         by = number(w, d), to[3];
    unsigned       i;
    numbers(w, d, 3, 100, to);
    if (w->odd && how % 2u) return ASKED;
    if (how == 0) s->x[at] += 0.05 * by;
    else if (how == 1) s->v[at] += by;
    for (i = 0; i < n && how > 1; i++)
        s->v[i] += by * to[i % 3] * (s->x[i - i % 3] - (how % 2u ? 0.1 : 0));
    cloth_sim_state_changed(b->sim);
    return DONE;
}

static void make_contact(world *w, fuzz_body *b, unsigned how) {
    cloth_collide_desc k = cloth_collide_desc_default();
    cloth_collide     *c = NULL;
    if (how % 2u) k.initial = CLOTH_INITIAL_EXEMPT;
    if (how % 4u > 1) k.thickness = 2e-5 * (1 + how);
    host_forget(&w->h);
    w->h.fail_at = w->hit = 0, w->before = cloth_sim_hash(b->sim);
    if (how > 225 && !w->second) w->h.fail_at = w->h.calls + 1 + (int)(how % 12u);
    require((judge(w, b, cloth_collide_create(b->sim, &k, &c)) == DONE) == (c != NULL));
    if (w->hit) w->hit = 0, (void)cloth_collide_create(b->sim, &k, &c);
    if (c) b->c = c;
}

/* how % 3: 0 before the sim, 1 the sim is told, 2 the sim goes first */
static void lose_contact(fuzz_body *b, unsigned how) {
    cloth_collide_destroy(b->old);
    b->old = b->c, b->c = NULL;
    if (how % 3u == 1) require(cloth_sim_set_contact(b->sim, NULL) == CLOTH_OK);
    if (how % 3u == 0) cloth_collide_destroy(b->old), b->old = NULL;
    memset(b->id, 0, sizeof b->id);
}

static void start(world *w, fuzz_body *b) {
    int i;
    memset(&b->k, 0, sizeof b->k);
    for (i = 0; i < w->d.npins; i++) b->k.pin[i] = CLOTH_AXIS_ALL;
    memcpy(b->k.goal, w->mesh->x, 3 * sizeof(double) * (size_t)w->mesh->nv);
}

static void make_sim(world *w, fuzz_body *b, unsigned how) {
    require((cloth_sim_create(w->model, &b->sim) == CLOTH_OK) == !w->hit);
    w->h.fail_at = w->hit = 0;
    if (!b->sim) require(cloth_sim_create(w->model, &b->sim) == CLOTH_OK);
    b->steps = b->has_term = 0;
    start(w, b);
    if (w->d.contact != CLOTH_CONTACT_NONE && how % 16u) make_contact(w, b, how);
}

static fate call_layout(world *w, fuzz_body *b, bytes *d) {
    static const cloth_term tug = {"tug", NULL, tug_begin, tug_eval, NULL, tug_size, tug_save,
                                   tug_load, 10};
    const unsigned what = next(d) % 6u, how = next(d);
    const int      arm = w->h.fail_at;
    cloth_term     t = tug;
    w->h.fail_at = 0, w->whose[w->at] = 2;
    b->layout++;
    if (what == 0 && !b->has_term) {
        t.user = b, b->has_term = 1;
        require(cloth_sim_add_term(b->sim, &t) == CLOTH_OK);
    } else if (what == 1) {
        require(cloth_sim_reset(b->sim) == CLOTH_OK);
        start(w, b);
    } else if (what == 2) {
        lose_contact(b, how);
        cloth_sim_destroy(b->sim);
        w->h.fail_at = arm;
        make_sim(w, b, next(d));
    } else if (what > 2) {
        if (what > 3 && b->c) lose_contact(b, how % 2u);
        make_contact(w, b, next(d));
    }
    return DONE;
}

typedef fate call(world *w, fuzz_body *b, bytes *d);

static void one_call(world *w, const uint8_t *data) {
    static call *const calls[] = {
        call_step, call_step, call_step, call_step, call_step, call_step, call_step, call_step,
        call_step, call_step, call_pin, call_attach, call_attach, call_set, call_set,
        call_set, call_add, call_add, call_add, call_add, call_obstacle, call_obstacle,
        call_obstacle, call_save, call_restore, call_restore, call_ask, call_write, call_write,
        call_write, call_layout};
    bytes          d = fuzz_bytes(data, FUZZ_SLICE);
    call          *f = calls[next(&d) % (sizeof calls / sizeof *calls)];
    const unsigned arm = next(&d), me = arm & 1;
    fuzz_body     *b = w->body + me, *other = w->body + !me;
    const uint64_t theirs = cloth_sim_hash(other->sim);
    int            idle;
    host_forget(&w->h);
    w->account = 1 + (int)me, w->hit = w->odd = w->asked = 0;
    w->before = cloth_sim_hash(b->sim);
    w->answer = arm > 200 && arm < 215 ? 2 : 1;
    w->patience = arm > 200 && arm < 235 ? (int)(arm % 7u) : FUZZ_PATIENCE;
    if (!w->second) w->whose[w->at] = f == call_save ? 2 : (int)me;
    if (arm >= 238 && !w->second) w->h.fail_at = w->h.calls + 1 + (int)(arm % 18u * (arm % 3u));
    idle = f(w, b, &d) != DONE;
    w->h.fail_at = 0;
    require(cloth_sim_hash(other->sim) == theirs);
    require(!w->second || cloth_sim_hash(b->sim) == w->after[w->at]);
    w->after[w->at] = cloth_sim_hash(b->sim);
    w->idle[w->at] = idle;
}

static void describe(world *w, bytes *d, cloth_pin *pins) {
    cloth_desc    *k = &w->d;
    const unsigned pattern = next(d) % 3u, nx = next(d) % 4u, ny = next(d) % 4u;
    *k = cloth_desc_default();
    k->hooks = fuzz_hooks(&w->h);
    k->hooks.allocator.alloc = world_alloc, k->hooks.allocator.free = world_free;
    k->hooks.allocator.user = k->hooks.cancel.user = w;
    k->hooks.cancel.fn = world_stop;
    if (w->second) host_turn_round(&k->hooks, &w->workers, 3);
    w->account = w->hit = 0, w->answer = 1, w->patience = FUZZ_PATIENCE;
    require(cloth_mesh_sheet(NULL, (cloth_sheet_pattern)pattern, 2 + (int)nx, 2 + (int)ny, 0.3,
                             0.3, &w->mesh) == CLOTH_OK);
    cloth_desc_set_mesh(k, w->mesh);
    k->integrator = (cloth_integrator)(1 + next(d) % 3u);
    k->contact = (cloth_contact_rung)(3 - (int)(next(d) % 5u) % 3);
    k->membrane = next(d) < 50 ? CLOTH_MEMBRANE_SPRINGS : CLOTH_MEMBRANE_STVK;
    k->bend = (cloth_bend_model)(3 - next(d) % 3u);
    k->linear = (cloth_linear)(next(d) % 4u);
    k->substeps = next(d) < 200 ? 0 : (int)(next(d) % 5u);
    k->max_newton = next(d) < 200 ? 0 : (int)(next(d) % 5u);
    k->material.membrane = 300;
    k->wind_on = next(d) < 60, k->wind[0] = 2 * k->wind_on;
    k->sleep = next(d) < 100 ? 0.05 : 1;
    k->tolerance = next(d) < 220 ? k->tolerance : 1e-9;
    k->max_attachments = (int)(next(d) % 4u);
    k->npins = (int)(next(d) % 3u), k->pins = pins;
    pins[0].vertex = 0, pins[1].vertex = 1;
    pins[0].axes = pins[1].axes = CLOTH_AXIS_ALL;
    if (next(d) > 200 && !w->second) w->h.fail_at = 1 + (int)(d->p[-1] % 40u);
    require((cloth_model_create(k, &w->model) == CLOTH_OK) == !w->hit);
    w->h.fail_at = 0;
    if (w->hit) require(w->h.live == 0 && cloth_model_create(k, &w->model) == CLOTH_OK);
}

static void run(world *w, const uint8_t *data, size_t size) {
    bytes     d = fuzz_bytes(data, size < FUZZ_HEAD ? size : FUZZ_HEAD);
    cloth_pin pins[2];
    unsigned  how;
    int       i;
    describe(w, &d, pins);
    how = next(&d);
    for (i = 0; i < 2; i++) w->account = 1 + i, w->hit = 0, make_sim(w, w->body + i, next(&d));
    for (i = 0; i < FUZZ_CALLS && FUZZ_HEAD + FUZZ_SLICE * (size_t)(i + 1) <= size; i++) {
        w->at = i;
        if (!w->second || !w->idle[i]) one_call(w, data + FUZZ_HEAD + FUZZ_SLICE * i);
    }
    for (i = 0; i < 2; i++) {               /* contact last where `how` says so */
        fuzz_body *b = w->body + i;
        lose_contact(b, how >> i);
        cloth_sim_destroy(b->sim);
        free(b->kept);
    }
    cloth_model_destroy(w->model);
    for (i = 0; i < 2; i++) cloth_collide_destroy(w->body[i].old);
    cloth_mesh_destroy(NULL, w->mesh);
    require(w->h.live == 0 && w->bytes[0] + w->bytes[1] + w->bytes[2] == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static world w;
    memset(&w, 0, sizeof w);
    for (w.second = 0; w.second < 2; w.second++) {
        memset(w.body, 0, sizeof w.body);
        run(&w, data, size);
    }
    return 0;
}

#ifdef FUZZ_MAIN
int main(int argc, char **argv) {
    if (argc < 2 || argv[1][0] != '-') return fuzz_replay(argc - 1, argv + 1, "fuzz_host");
    if (argc > 2) fuzz_seed = (uint64_t)atoi(argv[2]);
    fuzz_random(atof(argv[1] + 1), 236, "fuzz_host");
    return 0;
}
#endif
