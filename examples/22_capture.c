/* 22_capture.c - a camera sees the front of a skirt, with noise. What does physics add?
 *
 *            .-----.                 Hips that turn and sway, two legs that swing: the body is
 *     eye    | ::: |   waist         known. Of the skirt are known 160 points a frame, of the side
 *      o---> |: : :\                 that the eye sees alone, with 5 mm of noise on each number.
 *            | : : :\                They were made by a mesh twice as fine at a third of the step.
 *            '--/-/--'  body
 *
 * The motion sought is that of an embedded graph, p = a rotation and a translation a node:
 *
 *     L(p) = 0.2 sum_points |x(near) - point|^2 + rigidity + waist      x = graph(p)     WITHOUT
 *          + 20000 / nv sum_v |y_v - x_v|^2     y: simulated from the frames before      WITH
 *
 * First frame by frame: y comes of the two frames that are done, so L is cheap. Then all together:
 * windows of F = 5 (cloth_layer_loss), which hands the derivative of every simulated frame by those
 * it began with to the graph (cloth_graph_vjp), and L-BFGS.
 *
 * Notice the crossings: 15 without physics, none with it where what is left is parted; and the
 * error, of which 58 % is left: 59 +- 3 % over 5 seeds of the noise and 3 truths that began to
 * settle 1e-9 m apart and are 4 cm apart when they have, 66 % at most. The frames one by one give
 * nearly all of it; all together change it by 0.1 mm. (Ended at 60 iterations or a change of 1e-4,
 * as it was, one fit of the 15 stopped where a fold had turned over, at 88 %.) The template is a
 * scan of frame 0, as that of a performer is. With bending 2e-4 55 to 70 % are left; with 2e-5 81
 * to 97 %: the skirt folds finer than the coarse mesh can, and what a model has wrong, its loss
 * defends. With a mesh of 36 x 12 and 2e-4 it is 46 to 56 %.
 *
 * Two things keep a frame that a leg enters too fast from spoiling the rest: stride(), which takes
 * shorter steps where one fails, and r.failed in recover(): what failed has no y to fit.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 22_capture.c -lm
 *   `22_capture full`: 3 truths, 5 seeds of the noise each, mean and spread
 *   page:     out/22_capture.html
 *   expected: the error at most 0.7 of that without the simulation loss, no new crossing: yes
 *
 * Exercises: (1) NOISE 0.02: which of the two suffers? (2) BETA_SIM 200 and 2e6: what is too much?
 * (3) an eye that sees all round (nz > -1): what is left of the gain? (4) NODES 24.
 */
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "optimise.h"
#include "view.h"
#include <stdio.h>

#define PI       3.14159265358979
#define NOISE    5e-3               /* m                                                       */
#define RIGID    0.1                /* 1/m^2, of the graph                                     */
#define WAIST    30.0               /* 1/m^2, of all vertices there together                   */
#define OFF      1e-9               /* m                                                       */
#define BETA_SIM CLOTH_DEFAULT_BETA_SIM
enum {
    AROUND = 28, ALONG = 9, NV = AROUND * ALONG, SIZE = 3 * NV,
    FRAMES = 16, RATE = 30, FINE = 3,           /* steps of a frame in what is seen            */
    POINTS = 160, SEEN = FRAMES * 3 * POINTS, SEEDS = 5, TRUTHS = 3, HALVINGS = 6,
    NODES = 84, NP = 6 * NODES, BODY = 3, WINDOW = 5, TOGETHER = 6
};

typedef struct skirt {
    int            around;
    cloth_mesh    *mesh;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *contact;
    cloth_obstacle body[BODY];
    const double  *waist;           /* [around x 3] at time 0                                  */
} skirt;

typedef struct capture {
    skirt        s;
    cloth_graph *graph;
    double       drape[SIZE];
    double       truth[FRAMES * SIZE], seen[SEEDS * SEEN];
    const double *point;            /* [FRAMES x POINTS x 3] of this seed                      */
    double       x[FRAMES * SIZE], g[FRAMES * SIZE], y[SIZE];
    int          frame, base, simulated;        /* frame -1: all together                      */
    int          failed, gaps;      /* frames: of the last windows; one by one                 */
} capture;

static const double radius[BODY] = {0.075, 0.075, 0.1};

static double uniform(unsigned *s) {
    *s = *s * 1664525u + 1013904223u;
    return (*s >> 8) / 16777216.0;
}

static double noise(unsigned *s) {              /* of mean 0 and variance 1                    */
    double t = -6;
    for (int i = 0; i < 12; i++) t += uniform(s);
    return t;
}

static double begin(double t) {
    t /= 0.25;
    return t <= 0 ? 0 : t >= 1 ? 1 : t * t * (3 - 2 * t);
}

static void hips(double t, const double *in, double *out) {
    const double a = 0.7 * begin(t) * sin(2 * PI * 1.2 * t), c = cos(a), s = sin(a);
    out[0] = c * in[0] + s * in[2] + 0.06 * begin(t) * sin(2 * PI * 1.7 * t);
    out[1] = in[1];
    out[2] = c * in[2] - s * in[0];
}

static void capsule(int k, double t, double *x) {       /* legs 0, 1; hips 2                   */
    double ends[6] = {-0.05, 1.0, 0, 0.05, 1.0, 0};
    if (k < 2) {
        const double side = k ? 1 : -1, swing = 0.5 * side * begin(t) * sin(2 * PI * 1.4 * t);
        ends[0] = side * 0.085, ends[1] = 0.92;
        ends[3] = side * 0.10, ends[4] = 0.92 - 0.6 * cos(swing), ends[5] = 0.6 * sin(swing);
    }
    hips(t, ends, x), hips(t, ends + 3, x + 3);
}

/* start 1: body and cloth are at time t already; 0: where the next step takes them. */
static cloth_status place(const skirt *s, double t, int start) {
    cloth_status status = CLOTH_OK;
    double       x[6];
    for (int k = 0; k < BODY && !status; k++) {
        capsule(k, t, x);
        status = start ? cloth_collide_teleport(s->contact, s->body[k], x) :
                         cloth_collide_move(s->contact, s->body[k], x);
    }
    for (int i = 0; i < s->around && !status; i++) {
        hips(t, s->waist + 3 * i, x);
        status = cloth_sim_pin(s->sim, s->mesh->nv - s->around + i, CLOTH_AXIS_ALL,
                               start ? NULL : x);
    }
    return status;
}

/* `off`: m, by how much vertices are beside the cone where the cloth begins to settle. */
static cloth_status skirt_open(skirt *s, int fine, double off, unsigned seed) {
    cloth_desc         desc = cloth_desc_default();
    cloth_collide_desc contact = cloth_collide_desc_default();
    cloth_status       status;
    s->around = fine * AROUND;
    status = cloth_mesh_tube(NULL, 1, 1, fine * AROUND, fine * (ALONG - 1) + 1, &s->mesh);
    if (status) return status;
    for (int v = 0; v < s->mesh->nv; v++) {
        double *x = s->mesh->x + 3 * v, u = 1 - x[1], r = 0.15 + 0.17 * u;
        x[0] *= r, x[2] *= r, x[1] = 1.02 - 0.42 * u;
    }
    s->waist = s->mesh->x + 3 * (s->mesh->nv - s->around);
    cloth_desc_set_mesh(&desc, s->mesh);
    desc.X = NULL, desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    desc.hooks.log.fn = cloth_log_stderr, desc.tolerance = 1e-5, desc.contact = CLOTH_CONTACT_SELF;
    desc.material.density = 0.2, desc.material.membrane = 500, desc.material.bending = 3e-4;
    desc.material.damping = 0.002;
    contact.initial = CLOTH_INITIAL_EXEMPT, contact.thickness = 4e-3;
    status = cloth_model_create(&desc, &s->model);
    if (!status) status = cloth_sim_create(s->model, &s->sim);
    if (!status) status = cloth_collide_create(s->sim, &contact, &s->contact);
    for (int k = 0; k < BODY && !status; k++) {
        cloth_obstacle_desc o = cloth_obstacle_desc_default();
        double              x[6];
        capsule(k, 0, x);
        o.kind = CLOTH_OBSTACLE_CAPSULE, o.x = x, o.radius = radius[k];
        status = cloth_collide_add(s->contact, &o, &s->body[k]);
    }
    if (!status) status = place(s, 0, 0);
    for (int i = 0; i < 3 * (s->mesh->nv - s->around) && off > 0 && !status; i++)
        cloth_sim_state(s->sim)->x[i] += off * noise(&seed);
    if (!status) cloth_sim_state_changed(s->sim);
    for (int i = 0; i < 40 && !status; i++) status = cloth_step(s->sim, 1.0 / RATE, NULL);
    return status;
}

static void skirt_close(skirt *s) {
    cloth_collide_destroy(s->contact), cloth_sim_destroy(s->sim), cloth_model_destroy(s->model);
    cloth_mesh_destroy(NULL, s->mesh);
}

/* The vertices of the coarse tube in one twice as fine; odd rows are turned by half a cell. */
static void at_coarse(const skirt *fine, const double *x, double *out) {
    for (int j = 0; j < ALONG; j++)
        for (int i = 0; i < AROUND; i++) {
            const int at = (2 * i + j % 2) % fine->around;
            memcpy(out + 3 * (j * AROUND + i), x + 3 * (2 * j * fine->around + at), 3 * sizeof *x);
        }
}

/* Points of what looks along +z at the eye, by area, with noise. */
static void see(const skirt *s, const double *x, unsigned *seed, double *point) {
    for (int n = 0; n < POINTS;) {
        const int    *v = s->mesh->faces + 3 * (int)(uniform(seed) * s->mesh->nf);
        const double *a = x + 3 * v[0], *b = x + 3 * v[1], *c = x + 3 * v[2];
        double        u = uniform(seed), w = uniform(seed);
        const double  nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if (nz <= 1e-5) continue;
        if (u + w > 1) u = 1 - u, w = 1 - w;
        for (int k = 0; k < 3; k++)
            point[3 * n + k] = a[k] + u * (b[k] - a[k]) + w * (c[k] - a[k]) + NOISE * noise(seed);
        n++;
    }
}

/* The truth; those after the first differ from it by OFF where they begin to settle. */
static cloth_status film(capture *q, int truth) {
    skirt        fine = {0};
    cloth_status status = skirt_open(&fine, 2, truth ? OFF : 0, (unsigned)truth);
    for (int k = 0; k < FRAMES && !status; k++) {
        for (int m = 1; m <= FINE && k > 0 && !status; m++) {
            status = place(&fine, (k - 1 + (double)m / FINE) / RATE, 0);
            if (!status) status = cloth_step(fine.sim, 1.0 / RATE / FINE, NULL);
        }
        at_coarse(&fine, cloth_sim_state(fine.sim)->x, q->truth + k * SIZE);
        for (int s = 0; s < SEEDS; s++) {
            unsigned seed = (unsigned)(1 + s + 100 * k);
            see(&fine, cloth_sim_state(fine.sim)->x, &seed, q->seen + s * SEEN + k * 3 * POINTS);
        }
    }
    skirt_close(&fine);
    return status;
}

static double part(const double *x, const double *y, int n, double beta, double *g) {
    double sum = 0;
    for (int i = 0; i < n; i++) {
        sum += beta * (x[i] - y[i]) * (x[i] - y[i]);
        g[i] += 2 * beta * (x[i] - y[i]);
    }
    return sum;
}

/* What frame k costs without physics; q->g of it is written, the rigidity's share of g added. */
static double fits(capture *q, int k, const double *p, double *g, cloth_status *status) {
    double       *x = q->x + k * SIZE, *gx = q->g + k * SIZE, waist[3 * AROUND], L = 0;
    double        bary[3 * POINTS];
    int           face[POINTS];
    cloth_targets t = cloth_targets_default();
    t.nv = NV, t.nf = q->s.mesh->nf, t.faces = q->s.mesh->faces;
    t.n = POINTS, t.face = face, t.bary = bary, t.target = q->point + k * 3 * POINTS;
    memset(gx, 0, SIZE * sizeof *gx);
    if (!*status) *status = cloth_graph_deform(NULL, q->graph, q->drape, p, x);
    if (!*status) *status = cloth_nearest_on_mesh(NULL, NV, x, t.nf, t.faces, POINTS, t.target,
                                                  HUGE_VAL, face, bary);
    if (!*status) *status = cloth_loss_targets(&t, x, &L, gx);
    if (!*status) *status = cloth_graph_rigidity(NULL, q->graph, p, RIGID, &L, g);
    for (int i = 0; i < AROUND; i++)
        hips((double)k / RATE, q->s.waist + 3 * i, waist + 3 * i);
    return L + part(x + SIZE - 3 * AROUND, waist, 3 * AROUND, WAIST / AROUND,
                    gx + SIZE - 3 * AROUND);
}

static cloth_status put(cloth_sim *sim, int frame, int start, void *user) {
    const capture *q = (const capture *)user;
    (void)sim;
    return place(&q->s, (double)(q->base + frame) / RATE, start);
}

/* One step, or shorter ones where a leg goes too far into the skirt for it. */
static cloth_status stride(cloth_sim *sim, double h, void *user) {
    const capture *q = (const capture *)user;
    cloth_status   status = CLOTH_OK;
    (void)sim;
    while (h > 0 && !status) {
        status = cloth_collide_step(q->s.contact, h, HALVINGS, NULL);
        h -= h * cloth_collide_last(q->s.contact).fraction;
    }
    return status;
}

static cloth_layer layer(capture *q, int base, int frames, const double *x) {
    cloth_layer o = cloth_layer_default();
    q->base = base;
    o.frames = frames, o.h = 1.0 / RATE, o.backward = 1, o.x = x, o.beta = BETA_SIM;
    o.place = put, o.step = stride, o.user = q;
    return o;
}

static double value(const double *p, double *g, void *user) {
    capture     *q = (capture *)user;
    const int    from = q->frame < 0 ? 0 : q->frame, to = q->frame < 0 ? FRAMES : from + 1;
    double       L = 0;
    cloth_status status = CLOTH_OK;
    memset(g, 0, (size_t)(to - from) * NP * sizeof *g);
    for (int k = from; k < to; k++) {
        L += fits(q, k, p + (k - from) * NP, g + (k - from) * NP, &status);
        if (q->frame >= 0 && q->simulated)
            L += part(q->x + k * SIZE, q->y, SIZE, BETA_SIM / NV, q->g + k * SIZE);
    }
    q->failed = 0;
    for (int b = 0; q->frame < 0 && q->simulated && b + 2 < FRAMES && !status; b += WINDOW - 2) {
        const int          n = b + WINDOW < FRAMES ? WINDOW : FRAMES - b;
        const cloth_layer  o = layer(q, b, n, q->x + b * SIZE);
        cloth_layer_report r;
        status = cloth_layer_loss(q->s.sim, &o, &L, q->g + b * SIZE, &r);
        if (!status) q->failed += r.failed;
    }
    for (int k = from; k < to && !status; k++)
        status = cloth_graph_vjp(NULL, q->graph, q->drape, p + (k - from) * NP, q->g + k * SIZE,
                                 g + (k - from) * NP, NULL);
    return status ? HUGE_VAL : L;
}

/* Frame by frame, then together. p [FRAMES x NP] */
static cloth_status recover(capture *q, int simulated, double *p) {
    static double    before[3 * SIZE], y[3 * SIZE];
    cloth_status     status = CLOTH_OK;
    optimise_options o = optimise_default();
    o.first = 0.02, o.most = 0.5, o.iterations = 120, o.change = 3e-5;
    memset(p, 0, FRAMES * NP * sizeof *p);
    for (int k = 0; k < FRAMES && !status; k++) {
        q->frame = k, q->simulated = simulated;
        for (int m = 0; m < 3; m++) {           /* x_(k-2), x_(k-1), and a guess of x_k        */
            const int at = m == 2 ? k - 1 : k + m - 2;
            memcpy(before + m * SIZE, k == 0 ? q->drape : q->x + (at > 0 ? at : 0) * SIZE,
                   SIZE * sizeof *y);
        }
        if (k) memcpy(p + k * NP, p + (k - 1) * NP, NP * sizeof *p);
        if (simulated) {
            cloth_layer        o3 = layer(q, k - 2, 3, before);
            cloth_layer_report r;
            o3.y = y;
            status = cloth_layer_loss(q->s.sim, &o3, NULL, NULL, &r);
            memcpy(q->y, y + 2 * SIZE, sizeof q->y);
            q->simulated = r.failed == 0;       /* else y is the guess, at rest                */
            q->gaps += r.failed;
        }
        if (!status && !(optimise_lbfgs(NP, p + k * NP, value, q, &o).f < HUGE_VAL))
            status = CLOTH_ERR_NUMERIC;
        if (!status) status = cloth_graph_deform(NULL, q->graph, q->drape, p + k * NP,
                                                 q->x + k * SIZE);
    }
    q->frame = -1, q->simulated = simulated, o.iterations = TOGETHER;
    if (!status && simulated) optimise_lbfgs(FRAMES * NP, p, value, q, &o);
    for (int k = 0; k < FRAMES && !status; k++)
        status = cloth_graph_deform(NULL, q->graph, q->drape, p + k * NP, q->x + k * SIZE);
    return status;
}

/* m, root of the mean square over vertices and frames. */
static double error_of(const capture *q, const double *x) {
    double e = 0;
    for (int i = 0; i < FRAMES * SIZE; i++) e += pow(x[i] - q->truth[i], 2);
    return sqrt(e / (FRAMES * NV));
}

/* m, the same of second differences around the skirt: its folds. */
static double fold_of(const capture *q, const double *x) {
    double e = 0;
    for (int r = 0; r < FRAMES * ALONG; r++)
        for (int i = 0; i < 3 * AROUND; i++) {
            const int a = r * 3 * AROUND + (i + 3 * AROUND - 3) % (3 * AROUND);
            const int b = r * 3 * AROUND + i, c = r * 3 * AROUND + (i + 3) % (3 * AROUND);
            e += pow(x[a] - 2 * x[b] + x[c] - q->truth[a] + 2 * q->truth[b] - q->truth[c], 2);
        }
    return sqrt(e / (FRAMES * NV));
}

/* The sim at frame k, cloth at x [nv x 3] with what of it crosses. */
static cloth_status stand(capture *q, int k, const double *x) {
    memcpy(cloth_sim_state(q->s.sim)->x, x, SIZE * sizeof *x);
    cloth_sim_state_changed(q->s.sim);
    return place(&q->s, (double)k / RATE, 1);
}

/* Pairs of faces that cross, of all frames, and vertices inside of the body. */
static int crossings(capture *q, const double *x) {
    int sum = 0;
    for (int k = 0; k < FRAMES; k++) {
        int n = 0;
        if (stand(q, k, x + k * SIZE) ||
            cloth_collide_intersections(q->s.contact, 0, NULL, &n)) return -1;
        for (int v = 0; v < NV; v++) {
            const double *at = x + k * SIZE + 3 * v;
            for (int b = 0; b < BODY; b++) {
                double e[6], s = 0, l = 0, d = 0;
                capsule(b, (double)k / RATE, e);
                for (int i = 0; i < 3; i++) {
                    s += (at[i] - e[i]) * (e[3 + i] - e[i]);
                    l += (e[3 + i] - e[i]) * (e[3 + i] - e[i]);
                }
                s = fmin(fmax(s / l, 0), 1);
                for (int i = 0; i < 3; i++) d += pow(at[i] - e[i] - s * (e[3 + i] - e[i]), 2);
                n += d < radius[b] * radius[b];
            }
        }
        sum += n;
    }
    return sum;
}

/* The waist is put where it is known to be, and what crosses cloth or body is parted. */
static cloth_status part_frames(capture *q, double *x) {
    cloth_status status = CLOTH_OK;
    for (int k = 0; k < FRAMES && !status; k++) {
        cloth_untangle_report r = {0};
        double               *waist = x + (k + 1) * SIZE - 3 * AROUND;
        for (int i = 0; i < AROUND; i++)
            hips((double)k / RATE, q->s.waist + 3 * i, waist + 3 * i);
        status = stand(q, k, x + k * SIZE);
        for (int i = 0; i < 40 && !status && (i == 0 || r.after > 0); i++)
            status = cloth_collide_untangle(q->s.contact, 0, &r);
        if (status == CLOTH_ERR_STEP) status = CLOTH_OK;        /* nothing more helps */
        if (!status) memcpy(x + k * SIZE, cloth_sim_state(q->s.sim)->x, SIZE * sizeof *x);
    }
    return status;
}

static void draw_body(view *page, int mesh, int k, double t, double shift) {
    double unit[3], x[3 * VIEW_BALL_NV], e[6];
    capsule(k, t, e);
    for (int v = 0; v < VIEW_BALL_NV; v++) {
        double along = 0;
        view_ball_point(v, unit);
        for (int i = 0; i < 3; i++) along += unit[i] * (e[3 + i] - e[i]);
        for (int i = 0; i < 3; i++)
            x[3 * v + i] = e[(along > 0 ? 3 : 0) + i] + (i ? 0 : shift) + radius[k] * unit[i];
    }
    view_put(page, mesh, x, NULL, NULL);
}

static const char *draw(const capture *q, const double *without, const double *with) {
    static const char *const name[3] = {"truth", "without physics", "with physics"};
    const double *x[3] = {q->truth, without, with};
    view         *page = view_open("A skirt seen from the front, in noise", "");
    for (int m = 0; m < 3; m++)
        view_mesh(page, name[m], VIEW_CLOTH, NV, q->s.mesh->nf, q->s.mesh->faces);
    for (int b = 0; b < 3 * BODY; b++) view_ball(page, "body");
    view_camera(page, 20, 12);
    view_caption(page, "A known body, 160 noisy points a frame of the side in front: the skirt as "
                       "it was, as points and stiffness tell it, and with the simulation loss.");
    for (int k = 0; k < FRAMES; k++) {
        view_time(page, (double)k / RATE);
        for (int m = 0; m < 3; m++) {
            double at[SIZE];
            for (int i = 0; i < SIZE; i++)
                at[i] = x[m][k * SIZE + i] + (i % 3 ? 0 : 0.75 * (m - 1));
            view_put(page, m, at, NULL, NULL);
            for (int b = 0; b < BODY; b++)
                draw_body(page, 3 + m * BODY + b, b, (double)k / RATE, 0.75 * (m - 1));
        }
    }
    return view_close(page, "out/22_capture.html");
}

typedef struct tally {
    int    n, crossed;              /* fits; those that cross                                  */
    double sum, square, worst;      /* of ratios                                               */
} tally;

/* One seed of the noise, without physics and with. */
static cloth_status fit(capture *q, int truth, int seed, tally *t, const char **error) {
    static double p[FRAMES * NP], x[2][FRAMES * SIZE];
    double        ratio;
    int           n[2];
    q->point = q->seen + seed * SEEN, q->gaps = 0;
    for (int m = 0; m < 2; m++) {
        cloth_status status = recover(q, m, p);
        if (!status && m == 1) status = part_frames(q, q->x);
        if (status) return status;
        memcpy(x[m], q->x, sizeof x[m]);
        n[m] = crossings(q, x[m]);
    }
    ratio = error_of(q, x[1]) / error_of(q, x[0]);
    printf("%5d %4d %10.1f mm %5.1f mm %5d %15.1f mm %5.1f mm %5d %7d %7.3f\n", truth + 1, seed + 1,
           1e3 * error_of(q, x[0]), 1e3 * fold_of(q, x[0]), n[0], 1e3 * error_of(q, x[1]),
           1e3 * fold_of(q, x[1]), n[1], q->failed + q->gaps, ratio);
    t->n++, t->sum += ratio, t->square += ratio * ratio, t->worst = fmax(t->worst, ratio);
    t->crossed += n[1] != 0;
    if (t->n == 1) *error = draw(q, x[0], x[1]);
    return CLOTH_OK;
}

int main(int argc, char **argv) {
    static capture q;
    const int      full = argc > 1 && strcmp(argv[1], "full") == 0;
    const char    *error = NULL;
    tally          t = {0};
    if (skirt_open(&q.s, 1, 0, 0)) return 1;
    printf("%5s %4s %31s %41s %7s\n", "truth", "seed", "without", "with", "ratio");
    printf("%10s %13s %8s %9s %14s %8s %9s %7s\n", "", "error", "folds", "crossings", "error",
           "folds", "crossings", "failed");
    for (int truth = 0; truth < (full ? TRUTHS : 1); truth++) {
        if (film(&q, truth)) return 1;
        memcpy(q.drape, q.truth, sizeof q.drape);       /* the template: a scan of frame 0 */
        if (cloth_graph_create(NULL, NV, q.drape, NODES, 4, 0, &q.graph)) return 1;
        for (int s = 0; s < (full ? SEEDS : 1); s++)
            if (fit(&q, truth, s, &t, &error)) return 1;
        cloth_graph_destroy(NULL, q.graph);
    }
    if (error) printf("out/22_capture.html: %s\n", error);
    printf("ratio %.3f +- %.3f over %d\n", t.sum / t.n,
           sqrt(fmax(t.square / t.n - t.sum * t.sum / t.n / t.n, 0)), t.n);
    printf("the error at most 0.7 of that without the simulation loss, no new crossing: %s\n",
           t.worst <= 0.7 && !t.crossed && !error ? "yes" : "no");
    skirt_close(&q.s);
    return 0;
}
