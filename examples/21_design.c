/* 21_design.c - how must a panel be cut to hang with a level hem?
 *
 *       o---..___..---o   hooks          A soft panel on two hooks. At rest it sags between them,
 *       |             |                  and its hem does so too. Unknown is the cut: p_j metres
 *       |             |   cut            that column j is made longer by in the pattern, nothing
 *       '---..___..---'                  at the top, p_j at the hem:
 *
 *                                            v' = v + p_j v/H,    L = mean of (y_hem - level)^2
 *
 * Each L is a state of rest, dE/dx = 0 (cloth_solve_static). Its derivative needs no path to it:
 *
 *     dL/dp = - z . d(dE/dx)/dp,     H z = dL/dx,      H the Hessian at rest
 *
 * one linear solve for all p (the static adjoint), where differences need a state of rest for each.
 * cloth_grad_backward gives dL/dX, by every corner of the pattern, masses included: a piece that
 * is cut longer is heavier, too. The rest is the chain rule in three lines, of cut() backwards.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 21_design.c -lm
 *   page:     out/21_design.html
 *   expected: the hem is level to 0.1 mm (root of the mean square): yes
 *
 * Exercises: (1) MEMBRANE 10; (2) HOOKS 3: where is the panel made longer, where shorter? (3) cloth
 * costs: add c sum_j p_j to L. What is a level hem worth?
 */
#include "clothsim_grad.h"
#include "optimise.h"
#include "view.h"
#include <stdio.h>

#define WIDTH    0.9                /* m                                                       */
#define LENGTH   0.4                /* m                                                       */
#define MEMBRANE 30                 /* N/m                                                     */
enum { N = 19, ROWS = 13, NV = N * ROWS, SIZE = 3 * NV, MOST = 100, HOOKS = 2 };

typedef struct panel {
    cloth_mesh       *mesh;
    double            level;        /* m, of the hem                                           */
    double            x[SIZE];      /* at rest, of the last cut                                */
    double            shown[MOST * SIZE];
    cloth_grad_report report;
    int               runs, frames;
} panel;

/* The pattern with columns longer by p. */
static void cut(const panel *t, const double *p, double *X) {
    for (int i = 0; i < 3 * t->mesh->nf; i++) {
        const double v = t->mesh->X[2 * i + 1];
        X[2 * i] = t->mesh->X[2 * i];
        X[2 * i + 1] = v + p[t->mesh->faces[i] % N] * v / LENGTH;
    }
}

static double hem(const double *x, int j) { return x[3 * ((ROWS - 1) * N + j) + 1]; }

static void uneven(int k, const double *x, const double *v, double *gx, double *gv, void *user) {
    const panel *t = (const panel *)user;
    (void)v, (void)gv;
    for (int j = 0; k == 1 && j < N; j++)
        gx[3 * ((ROWS - 1) * N + j) + 1] = 2 * (hem(x, j) - t->level) / N;
}

/* L of the cut p [N], m^2; g = dL/dp. */
static double value(const double *p, double *g, void *user) {
    panel        *t = (panel *)user;
    const size_t  size = 6 * (size_t)t->mesh->nf * sizeof(double);
    double       *X = (double *)malloc(size), *gX = (double *)malloc(size), sum = 0;
    cloth_desc    desc = cloth_desc_default();
    cloth_pin     pins[HOOKS];
    cloth_grad    grad = {0};
    cloth_model  *model = NULL;
    cloth_sim    *sim = NULL;
    cloth_tape   *tape = NULL;
    cloth_status  status = X && gX ? CLOTH_OK : CLOTH_ERR_MEMORY;
    cloth_desc_set_mesh(&desc, t->mesh);
    for (int i = 0; i < HOOKS; i++)
        pins[i].vertex = i * (N - 1) / (HOOKS - 1), pins[i].axes = CLOTH_AXIS_ALL;
    if (!status) cut(t, p, X);
    desc.hooks.log.fn = cloth_log_stderr, desc.X = X, desc.pins = pins, desc.npins = HOOKS;
    desc.material.density = 0.3, desc.material.membrane = MEMBRANE;
    desc.material.bending = 1e-3, desc.tolerance = 1e-9;
    if (!status) status = cloth_model_create(&desc, &model);
    if (!status) status = cloth_sim_create(model, &sim);
    if (!status) status = cloth_tape_create(sim, NULL, &tape);
    if (!status) status = cloth_solve_static(sim, NULL);
    if (!status) memcpy(t->x, cloth_sim_state(sim)->x, sizeof t->x);
    for (int j = 0; j < N && t->runs == 0; j++) t->level += hem(t->x, j) / N;
    grad.X = gX;
    if (!status) status = cloth_grad_backward(tape, uneven, t, &grad, &t->report);
    memset(g, 0, N * sizeof *g);
    for (int i = 0; i < 3 * t->mesh->nf && !status; i++)
        g[t->mesh->faces[i] % N] += gX[2 * i + 1] * t->mesh->X[2 * i + 1] / LENGTH;
    for (int j = 0; j < N; j++) sum += pow(hem(t->x, j) - t->level, 2) / N;
    t->runs++;
    cloth_tape_destroy(tape), cloth_sim_destroy(sim), cloth_model_destroy(model);
    free(X), free(gX);
    return status ? HUGE_VAL : sum;
}

static void tell(int k, double f, const double *p, void *user) {
    panel *t = (panel *)user;
    printf("%2d  hem off by %7.3f mm  cut %5.1f mm at a hook, %5.1f in the middle  %s\n", k,
           1e3 * sqrt(f), 1e3 * p[0], 1e3 * p[(N - 1) / 2],
           t->report.valid ? "" : t->report.why);
    if (t->frames < MOST) memcpy(t->shown + t->frames++ * SIZE, t->x, sizeof t->x);
}

/* The sheet stands. */
static cloth_status make(panel *t) {
    cloth_status status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, ROWS, WIDTH, LENGTH,
                                           &t->mesh);
    for (int i = 0; i < NV && !status; i++) {
        double *x = t->mesh->x + 3 * i;
        x[0] -= WIDTH / 2, x[1] = -x[2], x[2] = 0;
    }
    return status;
}

/* The way of the search, beside the panel as it was first cut. */
static const char *draw(const panel *t) {
    view  *page = view_open("A cut for a level hem", "");
    double first[SIZE];
    view_mesh(page, "cut anew", VIEW_CLOTH, NV, t->mesh->nf, t->mesh->faces);
    view_mesh(page, "cut straight", VIEW_CLOTH, NV, t->mesh->nf, t->mesh->faces);
    view_pattern(page, 0, t->mesh->X), view_camera(page, 0, 5);
    view_caption(page, "A soft panel on two hooks, at rest. A second of this clip is four steps of "
                       "L-BFGS; each needs one linear solve for its 19 derivatives.");
    for (int i = 0; i < SIZE; i++)
        first[i] = t->shown[i] + (i % 3 == 0 ? 1.1 * WIDTH : 0);
    for (int k = 0; k < t->frames; k++) {
        view_time(page, 0.25 * k);
        view_put(page, 0, t->shown + k * SIZE, NULL, NULL);
        view_put(page, 1, first, NULL, NULL);
    }
    return view_close(page, "out/21_design.html");
}

int main(void) {
    static panel     t;
    double           p[N] = {0}, g[N];
    const char      *error = NULL;
    optimise_options o = optimise_default();
    optimise_result  r;
    int              good;
    if (make(&t)) return 1;
    tell(0, value(p, g, &t), p, &t);
    o.step = tell, o.first = o.most = 0.003, o.slope = 1e-6;
    r = optimise_lbfgs(N, p, value, &t, &o);
    printf("%d states of rest; by differences %d for each gradient\n", t.runs, 2 * N);
    if ((error = draw(&t)) != NULL) printf("out/21_design.html: %s\n", error);
    good = sqrt(r.f) < 1e-4 && t.report.valid && !error;
    printf("the hem is level to 0.1 mm (root of the mean square): %s\n", good ? "yes" : "no");
    cloth_mesh_destroy(NULL, t.mesh);
    return !good;
}
