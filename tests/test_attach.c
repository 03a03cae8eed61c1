/* test_attach.c - attachments to another face of the cloth (stitches) and to a face of an obstacle
 * that moves: differences, balance of forces, Newton's law, state, refusals.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_attach.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "host.h"

#define G     9.81
#define H     (1.0 / 60)
#define FACES 32                            /* of one sheet of 5 x 5 vertices                  */
#define MOST  200

static const double third[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};

typedef struct scene {
    cloth_desc     desc;
    cloth_mesh    *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    double         x[MOST];
    int            faces[6 * FACES];
    double         mass;                    /* kg, of all                                      */
} scene;

static scene S;
static host  heard;

/* n sheets of 0.2 m: upright one below the other, 0.02 m apart and without contact, or level in
 * planes y = 0, -0.05. */
static void open_sheets(int n, int upright, cloth_integrator integrator) {
    int i, k;
    memset(&S, 0, sizeof S);
    memset(&heard, 0, sizeof heard);
    S.desc = cloth_desc_default();
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 5, 5, 0.2, 0.2, &S.mesh)) exit(2);
    for (k = 0; k < n; k++) {
        for (i = 0; i < 25; i++) {
            double *x = S.x + 75 * k + 3 * i;
            memcpy(x, S.mesh->x + 3 * i, 3 * sizeof *x);
            x[1] = upright ? -x[2] - 0.22 * k : -0.05 * k;
            x[2] = upright ? 0 : x[2];
        }
        for (i = 0; i < 3 * FACES; i++) S.faces[3 * FACES * k + i] = S.mesh->faces[i] + 25 * k;
    }
    S.desc.hooks = host_hooks(&heard);
    S.desc.nv = 25 * n, S.desc.x_rest = S.x;
    S.desc.nf = FACES * n, S.desc.faces = S.faces;
    S.desc.material.membrane = 300;
    S.desc.material.bending = 1e-5;
    S.desc.material.density = 0.2;
    S.desc.tolerance = 1e-9;
    S.desc.cg_tolerance = 1e-8;
    S.desc.integrator = integrator;
    S.desc.contact = upright ? CLOTH_CONTACT_NONE : CLOTH_CONTACT_OBSTACLES;
    if (cloth_model_create(&S.desc, &S.model) || cloth_sim_create(S.model, &S.sim)) exit(2);
    if (!upright && cloth_collide_create(S.sim, NULL, &S.c)) exit(2);
    for (i = 0; i < S.desc.nv; i++) S.mass += cloth_sim_params(S.sim)->mass[i];
}

static void shut(void) {
    cloth_collide_destroy(S.c);
    cloth_sim_destroy(S.sim);
    cloth_model_destroy(S.model);
    cloth_mesh_destroy(NULL, S.mesh);
    CHECK(heard.live == 0);
}

/* Refused with this status, by a line that holds `text`, and nothing changed. */
static uint64_t before;

static int kept(cloth_status status, cloth_status want, const char *text) {
    int ok = status == want && strstr(heard.text, text) != NULL && cloth_sim_hash(S.sim) == before;
    if (!ok) printf("  %d, '%s' lacks '%s'\n", (int)status, heard.text, text);
    host_forget(&heard);
    return ok;
}

static void centre(const double *x, const int *face, double *p) {
    int i;
    p[0] = p[1] = p[2] = 0;
    for (i = 0; i < 9; i++) p[i % 3] += x[3 * face[i / 3] + i % 3] / 3;
}

static void box_at(double x, double y, double z, double *corner) {
    const double middle[3] = {x, y, z}, half[3] = {0.15, 0.05, 0.15};
    cloth_obstacle_box(middle, half, NULL, corner);
}

static cloth_obstacle add_box(double x, double y, double z) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    double              corner[24];
    box_at(x, y, z, corner);
    o.kind = CLOTH_OBSTACLE_BOX, o.x = corner;
    CHECK(cloth_collide_add(S.c, &o, &id) == CLOTH_OK);
    return id;
}

/* The face under a box above (x, z), and where in it. */
static int under(cloth_obstacle id, const double *p, double *at) {
    const clothi_obstacle *o = clothi_obstacle_of(S.c, id, "under");
    int                    f, k;
    for (f = 0; f < o->nf; f++) {
        const double *q[3];
        double        area;
        for (k = 0; k < 3; k++) q[k] = o->x + 3 * o->faces[3 * f + k];
        if (!(q[0][1] == o->x[1] && q[1][1] == o->x[1] && q[2][1] == o->x[1])) continue;
        area = (q[1][0] - q[0][0]) * (q[2][2] - q[0][2]) -
               (q[2][0] - q[0][0]) * (q[1][2] - q[0][2]);
        for (k = 0; k < 3; k++) {
            const double *a = q[(k + 1) % 3], *b = q[(k + 2) % 3];
            at[k] = ((a[0] - p[0]) * (b[2] - p[2]) - (b[0] - p[0]) * (a[2] - p[2])) / area;
        }
        if (at[0] >= 0 && at[1] >= 0 && at[2] >= 0) return f;
    }
    exit(2);
}

/* Every face of the sheet by its middle to the box above it, K N/m in all. */
static void hang_all(cloth_obstacle id, double K) {
    int f;
    for (f = 0; f < FACES; f++) {
        cloth_attachment one;
        double           p[3], at[3];
        int              to;
        centre(S.x, S.faces + 3 * f, p);
        to = under(id, p, at);
        CHECK(cloth_collide_attach(S.c, id, to, at, f, third, K / FACES, &one) == CLOTH_OK);
    }
}

/* --- differences --- */

static double value(const cloth_step_input *in, const double *x, double *grad, cloth_matrix *hess) {
    cloth_eval e;
    double     energy = NAN;
    memset(&e, 0, sizeof e);
    e.model = S.model, e.in = in, e.nv = S.desc.nv, e.x = x, e.grad = grad, e.hess = hess;
    if (grad) memset(grad, 0, 3 * (size_t)e.nv * sizeof *grad);
    CHECK(clothi_attach_eval(NULL, &e, &energy) == CLOTH_OK);
    return energy;
}

/* The energy is quadratic: central differences are exact but for rounding. Faces far apart, faces
 * that share an edge, and faces that share a vertex with another stitch. */
static void differences(void) {
    static const double a[3] = {0.2, 0.3, 0.5}, b[3] = {0.6, 0.3, 0.1};
    double              x[MOST], g[MOST], up[MOST], down[MOST], d[MOST], Hd[MOST];
    cloth_attachment    id;
    cloth_step_input    in;
    cloth_matrix       *A;
    double              e = 1e-3, slope, off = 0, most = 0;
    int                 i, j, n;
    open_sheets(2, 1, CLOTH_INTEGRATOR_EULER);
    n = 3 * S.desc.nv;
    CHECK(cloth_sim_stitch(S.sim, 3, a, 50, 40, b, &id) == CLOTH_OK);
    CHECK(cloth_sim_stitch(S.sim, 4, b, 20, 5, a, &id) == CLOTH_OK);
    CHECK(cloth_sim_stitch(S.sim, 41, third, 7, 3, a, &id) == CLOTH_OK);
    memset(&in, 0, sizeof in);
    in.nattach = S.desc.max_attachments, in.attach = S.sim->attach, in.share[1] = 0.75;
    CHECK(cloth_matrix_create(NULL, S.model->pattern, &A) == CLOTH_OK);
    for (i = 0; i < n; i++) x[i] = S.x[i] + 0.01 * sin(7.0 * i), d[i] = cos(3.0 * i);
    CHECK(value(&in, x, g, A) > 0);
    for (i = 0; i < n; i++) {
        const double was = x[i];
        x[i] = was + e, slope = value(&in, x, NULL, NULL);
        x[i] = was - e, slope = (slope - value(&in, x, NULL, NULL)) / (2 * e);
        x[i] = was;
        off = fmax(off, fabs(slope - g[i])), most = fmax(most, fabs(g[i]));
    }
    CHECK(most > 1 && off < 1e-10 * most);
    cloth_matrix_mul(A, NULL, d, Hd);
    for (j = 1, off = most = 0; j >= -1; j -= 2) {
        for (i = 0; i < n; i++) x[i] += j * e * d[i];
        value(&in, x, j > 0 ? up : down, NULL);
        for (i = 0; i < n; i++) x[i] -= j * e * d[i];
    }
    for (i = 0; i < n; i++) {
        off = fmax(off, fabs((up[i] - down[i]) / (2 * e) - Hd[i]));
        most = fmax(most, fabs(Hd[i]));
    }
    CHECK(most > 1 && off < 1e-5 * most);   /* the matrix may be of floats                     */
    cloth_matrix_destroy(A);
    shut();
}

/* a' d(grad)/d{targets, k} of a stitch, by differences. */
static void pulled_back(void) {
    static const double b[3] = {0.6, 0.3, 0.1};
    double              x[MOST], g[MOST], a[MOST], target[3 * 64] = {0}, stiff[64] = {0};
    cloth_attachment    id;
    cloth_step_input    in;
    cloth_eval          e;
    cloth_vjp           out;
    int                 i, j;
    open_sheets(2, 1, CLOTH_INTEGRATOR_EULER);
    CHECK(cloth_sim_stitch(S.sim, 3, third, 50, 40, b, &id) == CLOTH_OK);
    memset(&in, 0, sizeof in), memset(&e, 0, sizeof e), memset(&out, 0, sizeof out);
    in.nattach = S.desc.max_attachments, in.attach = S.sim->attach, in.share[1] = 0.75;
    for (i = 0; i < 3 * S.desc.nv; i++) x[i] = S.x[i] + 0.01 * sin(7.0 * i), a[i] = cos(3.0 * i);
    e.model = S.model, e.in = &in, e.nv = S.desc.nv, e.x = x;
    out.attach = target, out.attach_k = stiff;
    CHECK(clothi_attach_vjp(NULL, &e, a, &out) == CLOTH_OK);
    for (j = 0; j < 4; j++) {
        double *knob = j < 3 ? S.sim->attach->target + j : &S.sim->attach->k, was = *knob, d = 0;
        int     sign;
        for (sign = 1; sign >= -1; sign -= 2) {
            *knob = was + sign * 1e-3;
            value(&in, x, g, NULL);
            for (i = 0; i < 3 * S.desc.nv; i++) d += sign * a[i] * g[i] / 2e-3;
        }
        *knob = was;
        CHECK(fabs(d) > 1e-4);
        CHECK_NEAR(j < 3 ? target[j] : stiff[0], d, 1e-8 * fabs(d) + 1e-12);
    }
    shut();
}

/* --- stitches --- */

/* Edge of a face of sheet k along its lower (1) or upper row (0) at column i: face and weights. */
static int at_row(int k, int lower, int i, double *bary) {
    const int a = 25 * k + (lower ? 20 : 0) + i;
    int       f, j, n;
    for (f = FACES * k; f < FACES * (k + 1); f++) {
        for (j = n = 0; j < 3; j++) {
            bary[j] = S.faces[3 * f + j] == a || S.faces[3 * f + j] == a + 1 ? 0.5 : 0;
            n += bary[j] > 0;
        }
        if (n == 2) return f;
    }
    exit(2);
}

static void seam(double k, cloth_attachment *id) {
    int i;
    for (i = 0; i < 4; i++) {
        double    a[3], b[3];
        const int f = at_row(0, 1, i, a), g = at_row(1, 0, i, b);
        CHECK(cloth_sim_stitch(S.sim, f, a, k, g, b, id + i) == CLOTH_OK);
    }
}

/* The lower sheet hangs by its seam from the upper one: the stitches carry its weight. */
static void hang(void) {
    cloth_attachment id[4];
    double           pull[3] = {0, 0, 0}, r[3], w[6], m = 0;
    int              i, j, v[6];
    open_sheets(2, 1, CLOTH_INTEGRATOR_EULER);
    for (i = 0; i < 5; i++) CHECK(cloth_sim_pin(S.sim, i, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
    seam(40, id);
    CHECK(cloth_solve_static(S.sim, NULL) == CLOTH_OK);
    for (i = 0; i < 4; i++) {
        CHECK(clothi_attach_gap(S.model, NULL, S.sim->attach + i, S.sim->state.x, v, w, r) == 6);
        for (j = 0; j < 3; j++) pull[j] += 40 * r[j];
    }
    for (i = 25; i < 50; i++) m += cloth_sim_params(S.sim)->mass[i];
    printf("  the seam pulls %.9f N of %.9f N\n", pull[1], m * G);
    CHECK_NEAR(pull[1], m * 9.81, 1e-6 * m * 9.81);
    CHECK(fabs(pull[0]) < 1e-6 * m * G && fabs(pull[2]) < 1e-6 * m * G);
    shut();
}

/* Free sheets without gravity: stitches are inner forces, so that momentum stays none; who closed
 * them worked in the first step and never again. Leapfrog: a stiff seam bounds its substeps, and
 * its energy swings as h w of the seam has it, by 1/(1 - (h w/2)^2) at most, but does not grow. */
static void apart(void) {
    static const cloth_integrator rung[2] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_LEAPFROG};
    static const double           none[3] = {0, 0, 0};
    int                           q, i, k;
    for (q = 0; q < 2; q++) {
        cloth_attachment id[4];
        cloth_report     r;
        const double     part[3] = {0, 0.0199, 0};
        const int        steps = q ? 300 : 30;
        double           work = 0, kinetic = 0, most[2] = {0, 0};
        open_sheets(2, 1, rung[q]);
        CHECK(cloth_sim_set_gravity(S.sim, none) == CLOTH_OK);
        seam(q ? 2e5 : 50, id);
        for (i = 0; q && i < 4; i++)        /* 0.1 mm nearer                                   */
            CHECK(cloth_sim_attach_move(S.sim, id[i], part) == CLOTH_OK);
        for (i = 0; i < steps; i++) {
            CHECK(cloth_step(S.sim, q ? 1e-2 : H, &r) == CLOTH_OK);
            CHECK(i == 0 ? r.energy.pin_work > 0 : r.energy.pin_work == 0);
            work += r.energy.pin_work;
            for (k = 0; k < 3; k++) CHECK(fabs(r.momentum[k]) < 1e-8);
            CHECK(r.energy.total <= work * (q ? 1 / (1 - 0.8 * 0.8) : 1 + 1e-9));
            kinetic = fmax(kinetic, r.energy.kinetic);
            k = i >= steps / 2;
            most[k] = fmax(most[k], r.energy.total);
        }
        printf("  work %.4e J, left %.4e J, in motion %.4e J\n", work, r.energy.total, kinetic);
        CHECK(kinetic > 1e-2 * work && most[1] <= 1.002 * most[0]);
        shut();
    }
}

/* --- obstacles --- */

/* A box that rises at a constant acceleration a: what hangs from it stays k d = m (g + a) behind,
 * also in the steps of implicit Euler, and the box works with that force. */
static void follows(void) {
    const double   K = 8, a = 2, start = 0.012;
    cloth_obstacle box;
    cloth_report   r;
    double         corner[24], y = 0, last = 0, d = 0, want;
    int            n, i;
    open_sheets(1, 0, CLOTH_INTEGRATOR_EULER);
    box = add_box(0.1, start + 0.05, 0.1);
    hang_all(box, K);
    for (n = 1; n <= 240; n++) {
        last = y, y = 0.5 * a * (n * H) * (n * H);
        box_at(0.1, start + y + 0.05, 0.1, corner);
        CHECK(cloth_collide_move(S.c, box, corner) == CLOTH_OK);
        CHECK(cloth_step(S.sim, H, &r) == CLOTH_OK);
    }
    for (i = 0; i < 25; i++)
        d += (start + y - S.sim->state.x[3 * i + 1]) * cloth_sim_params(S.sim)->mass[i] / S.mass;
    want = S.mass * (G + a) / K;
    printf("  %.9f m behind of %.9f m; the box worked %.6e J\n", d, want, r.energy.pin_work);
    CHECK_NEAR(d, want, 1e-5 * want);
    CHECK_NEAR(r.energy.pin_work, K * want * (y - last), 1e-5 * K * want * (y - last));
    shut();
}

/* A pose carries its points, a teleport takes them there without a way. */
static void carried(void) {
    static const double turn[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1}, at[3] = {0.2, 0.3, 0.5};
    const double        to[3] = {0.3, 0.2, 0.1};
    cloth_obstacle      box;
    cloth_attachment    id;
    const cloth_step_attachment *q;
    double              corner[24], p[3] = {0, 0, 0}, want[3], was[3];
    int                 i, k;
    open_sheets(1, 0, CLOTH_INTEGRATOR_EULER);
    box = add_box(0.1, 1, 0.1);
    q = S.sim->attach;
    CHECK(cloth_collide_attach(S.c, box, 7, at, 4, third, 3, &id) == CLOTH_OK && q->used);
    box_at(0.1, 1, 0.1, corner);
    for (i = 0; i < 9; i++)
        p[i % 3] += at[i / 3] * corner[3 * clothi_box_faces[21 + i / 3] + i % 3];
    for (k = 0; k < 3; k++) CHECK_NEAR(q->target[k], p[k], 1e-14);
    CHECK(fabs(q->pose[1]) < 1e-14);        /* from where the cloth is */
    CHECK(cloth_collide_pose(S.c, box, turn, to) == CLOTH_OK);
    want[0] = to[0] - p[1], want[1] = to[1] + p[0], want[2] = to[2] + p[2];
    for (k = 0; k < 3; k++) CHECK_NEAR(q->target[k], want[k], 1e-14);
    memcpy(was, q->pose, sizeof was);
    S.sim->fraction = 0.25;                 /* of a step of a quarter                          */
    clothi_accept(S.sim);
    for (k = 0; k < 3; k++) CHECK_NEAR(q->pose[k], 0.75 * was[k] + 0.25 * want[k], 1e-14);
    for (k = 0; k < 3; k++) CHECK_NEAR(q->target[k], want[k], 1e-14);
    CHECK_NEAR(S.sim->fraction, 1, 0);
    box_at(0.1, 2, 0.1, corner);
    CHECK(cloth_collide_teleport(S.c, box, corner) == CLOTH_OK);
    for (k = 0; k < 3; k++) CHECK_NEAR(q->target[k], p[k] + (k == 1), 1e-14);
    CHECK(memcmp(q->target, q->pose, sizeof q->pose) == 0);
    CHECK(cloth_sim_attach_move(S.sim, id, to) == CLOTH_OK);    /* the box carries it no more  */
    box_at(0.1, 1, 0.1, corner);
    CHECK(cloth_collide_move(S.c, box, corner) == CLOTH_OK);
    CHECK(memcmp(q->target, to, sizeof to) == 0);
    shut();
}

/* 20 steps of a box on a crooked way. */
static uint64_t way(cloth_obstacle box) {
    int n;
    for (n = 0; n < 20; n++) {
        double corner[24], t = S.sim->state.t + H;
        box_at(0.1 + 0.2 * t, 0.07 + t * t, 0.1 - 0.1 * t, corner);
        CHECK(cloth_collide_move(S.c, box, corner) == CLOTH_OK);
        CHECK(cloth_step(S.sim, H, NULL) == CLOTH_OK);
    }
    return cloth_sim_hash(S.sim);
}

static void restored(void) {
    static unsigned char buf[1 << 16];
    cloth_obstacle       box;
    cloth_attachment     id;
    uint64_t             at, end;
    open_sheets(2, 0, CLOTH_INTEGRATOR_BDF2);
    box = add_box(0.1, 0.07, 0.1);
    hang_all(box, 8);
    CHECK(cloth_sim_stitch(S.sim, 3, third, 5, 40, third, &id) == CLOTH_OK);
    CHECK(cloth_sim_stitch(S.sim, 20, third, 5, 60, third, &id) == CLOTH_OK);
    (void)way(box);
    at = cloth_sim_hash(S.sim);
    CHECK(cloth_sim_save_size(S.sim) <= sizeof buf);
    CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
    end = way(box);
    CHECK(cloth_sim_detach(S.sim, id) == CLOTH_OK && cloth_sim_hash(S.sim) != end);
    CHECK(cloth_sim_restore(S.sim, buf, sizeof buf) == CLOTH_OK && cloth_sim_hash(S.sim) == at);
    CHECK(way(box) == end && end != at);
    CHECK(cloth_sim_reset(S.sim) == CLOTH_OK && S.sim->nattach == 0);
    shut();
}

/* What an obstacle carries goes with it, and only that; its slot's next tenant carries nothing. */
static void removed(void) {
    cloth_obstacle   box, other;
    cloth_attachment id[3];
    double           corner[24], was[3];
    open_sheets(1, 0, CLOTH_INTEGRATOR_EULER);
    box = add_box(0.1, 1, 0.1), other = add_box(0.1, 2, 0.1);
    CHECK(cloth_collide_attach(S.c, box, 0, third, 1, third, 2, id) == CLOTH_OK);
    CHECK(cloth_collide_attach(S.c, other, 11, third, 2, third, 2, id + 1) == CLOTH_OK);
    CHECK(cloth_sim_attach(S.sim, 3, third, 2, third, id + 2) == CLOTH_OK);
    CHECK(cloth_collide_remove(S.c, box) == CLOTH_OK && S.sim->nattach == 2);
    CHECK(cloth_sim_detach(S.sim, id[0]) == CLOTH_ERR_HANDLE);
    CHECK(cloth_step(S.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_sim_detach(S.sim, id[2]) == CLOTH_OK);
    cloth_collide_destroy(S.c);             /* the other box's stays where it is               */
    CHECK(S.sim->nattach == 1);
    memcpy(was, S.sim->attach[1].target, sizeof was);
    CHECK(cloth_collide_create(S.sim, NULL, &S.c) == CLOTH_OK);
    (void)add_box(0.1, 1, 0.1), other = add_box(0.1, 2, 0.1);
    box_at(0.1, 3, 0.1, corner);
    CHECK(cloth_collide_move(S.c, other, corner) == CLOTH_OK);
    CHECK(memcmp(was, S.sim->attach[1].target, sizeof was) == 0);
    CHECK(cloth_sim_detach(S.sim, id[1]) == CLOTH_OK);
    shut();
}

/* A handle that is stale when a sim is saved, by detach or by reset, is so in the one that goes on
 * from there. */
static void stale(void) {
    static unsigned char buf[1 << 14];
    cloth_attachment     gone, id;
    cloth_sim           *other;
    int                  i;
    for (i = 0; i < 2; i++) {
        open_sheets(1, 1, CLOTH_INTEGRATOR_EULER);
        CHECK(cloth_sim_attach(S.sim, 3, third, 5, third, &gone) == CLOTH_OK);
        CHECK((i ? cloth_sim_reset(S.sim) : cloth_sim_detach(S.sim, gone)) == CLOTH_OK);
        CHECK(cloth_sim_save_size(S.sim) <= sizeof buf);
        CHECK(cloth_sim_save(S.sim, buf, sizeof buf) == CLOTH_OK);
        CHECK(cloth_sim_create(S.model, &other) == CLOTH_OK);
        CHECK(cloth_sim_restore(other, buf, sizeof buf) == CLOTH_OK);
        CHECK(cloth_sim_attach(other, 8, third, 5, third, &id) == CLOTH_OK && id.id != gone.id);
        CHECK(cloth_sim_detach(other, gone) == CLOTH_ERR_HANDLE);
        CHECK(cloth_sim_detach(other, id) == CLOTH_OK);
        cloth_sim_destroy(other);
        shut();
    }
}

static void refusals(void) {
    static const double off[3] = {0.3, 0.3, 0.3}, ball[3] = {0, 5, 0};
    double              bad[3] = {0, NAN, 1};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      box, sphere, none = {0};
    cloth_attachment    id = {7};
    open_sheets(1, 0, CLOTH_INTEGRATOR_EULER);
    box = add_box(0.1, 1, 0.1);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = ball, o.radius = 0.1;
    CHECK(cloth_collide_add(S.c, &o, &sphere) == CLOTH_OK);
    before = cloth_sim_hash(S.sim);
#define STITCH(f, b, k, g, at) cloth_sim_stitch(S.sim, f, b, k, g, at, &id)
    CHECK(kept(STITCH(-1, third, 1, 2, third), CLOTH_ERR_ARGUMENT, "face -1 but nf = 32"));
    CHECK(kept(STITCH(1, third, 1, 32, third), CLOTH_ERR_ARGUMENT, "other face 32 but nf = 32"));
    CHECK(kept(STITCH(1, third, 1, -2, third), CLOTH_ERR_ARGUMENT, "other face -2"));
    CHECK(kept(STITCH(5, third, 1, 5, third), CLOTH_ERR_ARGUMENT, "face 5 but nf = 32, face 5"));
    CHECK(kept(STITCH(1, bad, 1, 2, third), CLOTH_ERR_NONFINITE, "bary[1] = "));
    CHECK(kept(STITCH(1, third, 1, 2, bad), CLOTH_ERR_NONFINITE, "at[1] = "));
    CHECK(kept(STITCH(1, third, 1, 2, off), CLOTH_ERR_ARGUMENT, "at sums to 0.9"));
    CHECK(kept(STITCH(1, third, -3, 2, third), CLOTH_ERR_ARGUMENT, "k = -3"));
    CHECK(kept(STITCH(1, third, NAN, 2, third), CLOTH_ERR_NONFINITE, "k = "));
    CHECK(kept(STITCH(1, third, 1, 2, NULL), CLOTH_ERR_ARGUMENT, "at is NULL"));
    CHECK(kept(STITCH(1, NULL, 1, 2, third), CLOTH_ERR_ARGUMENT, "bary is NULL"));
    CHECK(kept(cloth_sim_stitch(S.sim, 1, third, 1, 2, third, NULL), CLOTH_ERR_ARGUMENT, "id is"));
    CHECK(cloth_sim_stitch(NULL, 1, third, 1, 2, third, &id) == CLOTH_ERR_ARGUMENT && id.id == 0);
#define TIE(o, f, at, g, b, k) cloth_collide_attach(S.c, o, f, at, g, b, k, &id)
    CHECK(kept(TIE(none, 0, third, 1, third, 1), CLOTH_ERR_HANDLE, "obstacle 0 is not there"));
    CHECK(kept(TIE(box, 12, third, 1, third, 1), CLOTH_ERR_ARGUMENT, "obstacle_face 12 but obst"));
    CHECK(kept(TIE(box, -1, third, 1, third, 1), CLOTH_ERR_ARGUMENT, "obstacle_face -1"));
    CHECK(kept(TIE(sphere, 0, third, 1, third, 1), CLOTH_ERR_ARGUMENT, "obstacle 2 has 0"));
    CHECK(kept(TIE(box, 0, bad, 1, third, 1), CLOTH_ERR_NONFINITE, "at[1] = "));
    CHECK(kept(TIE(box, 0, off, 1, third, 1), CLOTH_ERR_ARGUMENT, "at sums to 0.9"));
    CHECK(kept(TIE(box, 0, NULL, 1, third, 1), CLOTH_ERR_ARGUMENT, "at is NULL"));
    CHECK(kept(TIE(box, 0, third, 32, third, 1), CLOTH_ERR_ARGUMENT, "face 32 but nf = 32"));
    CHECK(kept(TIE(box, 0, third, 1, third, -1), CLOTH_ERR_ARGUMENT, "k = -1"));
    CHECK(cloth_collide_attach(NULL, box, 0, third, 1, third, 1, &id) == CLOTH_ERR_HANDLE);
    shut();
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(differences);
    RUN(pulled_back);
    RUN(hang);
    RUN(apart);
    RUN(follows);
    RUN(carried);
    RUN(restored);
    RUN(removed);
    RUN(stale);
    RUN(refusals);
    return TEST_END();
}
