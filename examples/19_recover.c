/* 19_recover.c - what is it made of? Stretching, bending, friction of a cloth from its motion.
 *
 * Three strips of one cloth, each in a test that one number rules, as in a laboratory:
 *
 *     pull    ===== held          droop   ##=======.     slide    ---> 0.7 m/s
 *             |   |                        clamp    `.            _________
 *             |   |   f grows                         `           /////////
 *             vvvvv   to 50 N/m                                   the floor
 *
 * They are seen in 20 frames, at the vertices, with noise of 1 mm. What is seen was made by a mesh
 * twice as fine at a quarter of the step, so that the model that is fitted is wrong too. Unknown:
 *
 *     p = (log Y, log D, log mu),     L(p) = 1/(n F) sum_frames sum_v |x_v(p) - seen_v|^2
 *
 * One run forward, one backward (cloth_grad_backward: membrane, bending, friction at once), then
 * L-BFGS. Notice how Y, D, mu are found from ten times less and ten times more alike, and the three
 * numbers behind +-: what noise alone would do, sigma^2 over the curvature of L at the end. The
 * error is larger where the coarse mesh is: that is the model's, not the method's.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 19_recover.c -lm
 *   page:     out/19_recover.html
 *   expected: off by at most 5 % (Y), 5 % (D), 10 % (mu) from both starts: yes
 *
 * Exercises: (1) PULL 1: how far may Y be off before anybody sees it? (2) FRAMES 4; (3) NOISE 0:
 * what is left is the mesh's; (4) SPEED 0: mu has no gradient, and L-BFGS leaves it where it was.
 */
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "optimise.h"
#include "view.h"
#include <stdio.h>

#define FRAMES 20
#define NOISE  1e-3                 /* m                                                       */
#define PULL   50.0                 /* N/m at the end                                          */
#define SPEED  0.7                  /* m/s                                                     */
#define YOUNG  1000.0               /* N/m                                                     */
#define BEND   1e-4                 /* N m                                                     */
#define MU     0.3
enum { STEPS = 3 };                 /* of a frame of 1/60 s, in the fit                        */

typedef struct strip { int nx, nz; double width, height; } strip;
static const strip strips[3] = {{5, 11, 0.06, 0.15}, {16, 4, 0.09, 0.018}, {6, 6, 0.09, 0.09}};

typedef struct lab {                /* a mesh of the three, and what happens to it             */
    int         fine;               /* 1, 2: cells for each of the coarse ones                 */
    int         steps;              /* of a frame                                              */
    cloth_mesh *mesh;
    double     *v, *force;          /* [nv x 3] start; N at PULL 1                             */
    cloth_pin   pin[64];
    int         npin, first[4];     /* vertices of strip s: first[s] .. first[s + 1]           */
} lab;

typedef struct fit {
    lab     set;
    int     n;
    double *seen, *x;               /* [FRAMES x n x 3]                                        */
    int     runs;
} fit;

static double noise(unsigned *state) {      /* of mean 0 and variance 1: twelve uniform ones   */
    double sum = -6;
    for (int i = 0; i < 12; i++) {
        *state = *state * 1664525u + 1013904223u;
        sum += (*state >> 8) / 16777216.0;
    }
    return sum;
}

static int columns(const lab *a, int s) { return a->fine * (strips[s].nx - 1) + 1; }
static int rows(const lab *a, int s) { return a->fine * (strips[s].nz - 1) + 1; }

/* Pull hangs in x, y; droop lies along x, its clamp at x <= 0; slide lies on the floor. */
static void place(lab *a, int s, int i, int j, int v) {
    double      *x = a->mesh->x + 3 * v, seg = strips[1].width / (strips[1].nx - 1), z = x[2];
    const int    last = j == rows(a, 0) - 1, rim = i == 0 || i == columns(a, 0) - 1;
    if (s == 0) {
        x[1] = 0.4 - z, x[2] = 0;
        if (j == 0) a->pin[a->npin].vertex = v, a->pin[a->npin++].axes = CLOTH_AXIS_ALL;
        if (last) a->force[3 * v + 1] = -strips[0].width / (columns(a, 0) - 1) * (rim ? 0.5 : 1);
    } else if (s == 1) {
        x[0] -= seg, x[1] = 0.3, x[2] += 0.15;
        if (i > a->fine) return;
        a->pin[a->npin].vertex = v, a->pin[a->npin++].axes = CLOTH_AXIS_ALL;
    } else x[1] = 1.5e-3, x[2] += 0.3, a->v[3 * v] = SPEED;
}

static cloth_status lab_make(lab *a, int fine, int steps) {
    cloth_mesh  *m[3] = {NULL, NULL, NULL};
    cloth_status status = CLOTH_OK;
    memset(a, 0, sizeof *a);
    a->fine = fine, a->steps = steps;
    for (int s = 0; s < 3 && !status; s++)
        status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, columns(a, s), rows(a, s),
                                  strips[s].width, strips[s].height, m + s);
    if (!status) status = cloth_mesh_merge(NULL, m, 3, &a->mesh);
    for (int s = 0; s < 3; s++) cloth_mesh_destroy(NULL, m[s]);
    if (status) return status;
    a->v = (double *)calloc(6 * (size_t)a->mesh->nv, sizeof *a->v);
    if (a->v == NULL) return CLOTH_ERR_MEMORY;
    a->force = a->v + 3 * a->mesh->nv;
    for (int s = 0; s < 3; s++) {
        a->first[s + 1] = a->first[s] + columns(a, s) * rows(a, s);
        for (int v = a->first[s], i = 0; v < a->first[s + 1]; v++, i++)
            place(a, s, i % columns(a, s), i / columns(a, s), v);
    }
    return CLOTH_OK;
}

/* A hinge in the end of a clamp stands for half a segment: 17_elastica.c. */
static cloth_status stiff_clamp(const lab *a, cloth_sim *sim) {
    const cloth_topology *t = cloth_model_topology(cloth_sim_model(sim));
    cloth_params         *p = cloth_sim_params(sim);
    if (p == NULL) return CLOTH_ERR_MEMORY;
    for (int k = 0; k < t->nh; k++) {
        const int u = t->hinges[4 * k] - a->first[1], w = t->hinges[4 * k + 1] - a->first[1];
        const int n = columns(a, 1), inside = u >= 0 && w >= 0 && u < n * rows(a, 1);
        if (inside && u % n == a->fine && w % n == a->fine) p->hinge_scale[k] = 2;
    }
    return cloth_sim_params_changed(sim);
}

/* Runs the lab with p; each frame is handed to x [FRAMES x n x 3] at the vertices of the coarse
 * mesh. With a loss, g [3] = dL/dp. */
static cloth_status run(const lab *a, const double *p, double *x, cloth_loss_fn *loss, void *user,
                        double *g) {
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc floor = cloth_obstacle_desc_default();
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *contact = NULL;
    cloth_tape         *tape = NULL;
    cloth_obstacle      id;
    cloth_status        status;
    double              zero[3] = {0, 0, 0}, friction[2], membrane, bending;
    double             *f = (double *)calloc(3 * (size_t)a->mesh->nv, sizeof *f);
    int                 n = 0;
    if (f == NULL) return CLOTH_ERR_MEMORY;
    cloth_desc_set_mesh(&desc, a->mesh);
    desc.hooks.log.fn = cloth_log_stderr;
    desc.v = a->v, desc.npins = a->npin, desc.pins = a->pin;
    desc.integrator = CLOTH_INTEGRATOR_BDF2, desc.tolerance = 1e-6;
    desc.contact = CLOTH_CONTACT_OBSTACLES;
    desc.material.density = 0.2, desc.material.membrane = exp(p[0]);
    desc.material.bending = exp(p[1]);
    floor.kind = CLOTH_OBSTACLE_PLANE, floor.x = zero, floor.friction = exp(p[2]);
    floor.normal[0] = floor.normal[2] = 0, floor.normal[1] = 1;
    status = cloth_model_create(&desc, &model);
    if (!status) status = cloth_sim_create(model, &sim);
    if (!status) status = cloth_collide_create(sim, NULL, &contact);
    if (!status) status = cloth_collide_add(contact, &floor, &id);
    if (!status) status = stiff_clamp(a, sim);
    if (!status && loss) status = cloth_tape_create(sim, NULL, &tape);
    for (int k = 1; k <= FRAMES * a->steps && !status; k++) {
        const double pull = PULL * k / (FRAMES * a->steps);
        for (int i = 0; i < 3 * a->mesh->nv; i++) f[i] = pull * a->force[i];
        status = cloth_sim_set_force(sim, f);
        if (!status) status = cloth_step(sim, 1.0 / 60 / a->steps, NULL);
        if (status || k % a->steps) continue;
        for (int s = 0; s < 3; s++)
            for (int j = 0; j < rows(a, s); j += a->fine)
                for (int i = 0; i < columns(a, s); i += a->fine)
                    memcpy(x + 3 * n++, cloth_sim_state(sim)->x +
                           3 * (a->first[s] + j * columns(a, s) + i), 3 * sizeof *x);
    }
    if (!status && loss) {
        cloth_grad grad = {0};
        grad.membrane = &membrane, grad.bending = &bending, grad.friction = friction;
        status = cloth_grad_backward(tape, loss, user, &grad, NULL);
        if (!status) g[0] = exp(p[0]) * membrane, g[1] = exp(p[1]) * bending;
        if (!status) g[2] = exp(p[2]) * friction[1];
    }
    cloth_tape_destroy(tape), cloth_collide_destroy(contact), cloth_sim_destroy(sim);
    cloth_model_destroy(model), free(f);
    return status;
}

static void misfit(int k, const double *x, const double *v, double *gx, double *gv, void *user) {
    const fit    *q = (const fit *)user;
    const double *seen = q->seen + 3 * (size_t)q->n * (size_t)(k / STEPS - 1);
    (void)v, (void)gv;
    if (k == 0 || k % STEPS) return;
    for (int i = 0; i < 3 * q->n; i++) gx[i] += 2 * (x[i] - seen[i]) / (q->n * FRAMES);
}

static double value(const double *p, double *g, void *user) {
    fit   *q = (fit *)user;
    double sum = 0;
    q->runs++;
    if (run(&q->set, p, q->x, misfit, q, g)) return HUGE_VAL;
    for (int i = 0; i < 3 * q->n * FRAMES; i++) sum += pow(q->x[i] - q->seen[i], 2);
    return sum / (q->n * FRAMES);
}

/* By how much noise alone may move each of p: sigma sqrt((A^-1)_kk), A = n F/2 d2L/dp2, which is
 * J'J at the end; from differences of gradients. */
static int spread(fit *q, const double *p, double *out) {
    const double e = 0.01;
    double       a[3][3], at[3], up[3], down[3], det;
    for (int k = 0; k < 3; k++) {
        memcpy(at, p, sizeof at);
        at[k] = p[k] + e;
        if (!(value(at, up, q) < HUGE_VAL)) return 0;
        at[k] = p[k] - e;
        if (!(value(at, down, q) < HUGE_VAL)) return 0;
        for (int i = 0; i < 3; i++) a[k][i] = q->n * FRAMES * 0.5 * (up[i] - down[i]) / (2 * e);
    }
    det = a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
          a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
          a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        out[k] = NOISE * sqrt((a[i][i] * a[j][j] - a[i][j] * a[j][i]) / det);
    }
    return 1;
}

/* What was seen, the model it was begun with, and the model that was found, side by side. */
static const char *draw(const fit *q, const double *begun, const double *found) {
    static const char *const name[3] = {"seen", "begun with", "found"};
    const int     size = 3 * q->n;
    const double *x[3] = {q->seen, begun, found};
    double       *at = (double *)malloc((size_t)size * sizeof *at);
    view         *page = at ? view_open("Stretching, bending, friction from 20 frames", "") : NULL;
    for (int m = 0; m < 3; m++)
        view_mesh(page, name[m], VIEW_CLOTH, q->n, q->set.mesh->nf, q->set.mesh->faces);
    view_camera(page, 20, 18), view_floor(page, 0);
    view_caption(page, "A pull, a droop and a slide: seen with 1 mm of noise, begun with all three "
                       "numbers ten times too small, and as recovered.");
    for (int k = 0; k < FRAMES && at; k++) {
        view_time(page, (k + 1) / 60.0);
        for (int m = 0; m < 3; m++) {
            for (int i = 0; i < size; i++) at[i] = x[m][k * size + i] + (i % 3 ? 0 : 0.3 * m);
            view_put(page, m, at, NULL, NULL);
        }
    }
    free(at);
    return view_close(page, "out/19_recover.html");
}

int main(void) {
    static const double truth[3] = {YOUNG, BEND, MU}, bound[3] = {5, 5, 10};
    static const char  *const name[3] = {"Y/(N/m)", "D/(N m)", "mu"};
    const char      *error = NULL;
    double           p[3], sigma[3] = {0, 0, 0}, *begun;
    lab              fine = {0};
    fit              q = {0};
    int              within = 1;
    unsigned         seed = 1;
    optimise_options o = optimise_default();
    o.first = 0.5, o.change = 2e-6;
    for (int k = 0; k < 3; k++) p[k] = log(truth[k]);
    if (lab_make(&q.set, 1, STEPS) || lab_make(&fine, 2, 4 * STEPS)) return 1;
    q.n = q.set.mesh->nv;
    q.seen = (double *)malloc(9 * FRAMES * (size_t)q.n * sizeof *q.seen);
    if (q.seen == NULL) return 1;
    q.x = q.seen + 3 * FRAMES * q.n, begun = q.x + 3 * FRAMES * q.n;
    if (run(&fine, p, q.seen, NULL, NULL, NULL)) return 1;
    for (int i = 0; i < 3 * q.n * FRAMES; i++) q.seen[i] += NOISE * noise(&seed);
    printf("%-22s %18s %20s %16s\n", "", name[0], name[1], name[2]);
    for (int start = 0; start < 2; start++) {
        optimise_result r;
        for (int k = 0; k < 3; k++) p[k] = log(truth[k] * (start ? 10 : 0.1));
        if (!start && run(&q.set, p, begun, NULL, NULL, NULL)) return 1;
        r = optimise_lbfgs(3, p, value, &q, &o);
        if (!start && !spread(&q, p, sigma)) return 1;
        printf("from %-4g runs %2d", start ? 10.0 : 0.1, r.runs);
        printf("  left %.3f mm", 1e3 * sqrt(r.f / 3));
        for (int k = 0; k < 3; k++) {
            const double off = 100 * (exp(p[k]) / truth[k] - 1);
            printf("  %9.4g (%+.2f +- %.2f %%)", exp(p[k]), off, 100 * sigma[k]);
            within = within && fabs(off) <= bound[k];
        }
        printf("\n");
    }
    if (run(&q.set, p, q.x, NULL, NULL, NULL)) return 1;
    if ((error = draw(&q, begun, q.x)) != NULL) printf("out/19_recover.html: %s\n", error);
    printf("off by at most 5 %% (Y), 5 %% (D), 10 %% (mu) from both starts: %s\n",
           within && !error ? "yes" : "no");
    free(q.seen), free(q.set.v), free(fine.v);
    cloth_mesh_destroy(NULL, q.set.mesh), cloth_mesh_destroy(NULL, fine.mesh);
    return within && !error ? 0 : 1;
}
