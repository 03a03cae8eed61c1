/* test_loss.c - losses, nearest points, the simulation layer, the embedded graph: gradients against
 * central differences with Richardson extrapolation and against closed forms.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_loss.c -o test_loss -lm && ./test_loss */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "test.h"
#include "scene.h"

static host        told;
static cloth_hooks hooks;

/* --- differences --- */

typedef double value_fn(double eps, void *user);

#define LEVELS 6

/* d value/d eps at 0: of central differences at eps, eps/4, .. and their extrapolations the one
 * that differs least from the two that it is made of. */
static double difference(value_fn *fn, void *user, double eps) {
    double d[LEVELS][LEVELS], best = 0, error = HUGE_VAL;
    int    i, j;
    for (i = 0; i < LEVELS; i++, eps *= 0.25) {
        double power = 16;
        d[i][0] = (fn(eps, user) - fn(-eps, user)) / (2 * eps);
        for (j = 1; j <= i; j++, power *= 16) {
            double off;
            d[i][j] = (power * d[i][j - 1] - d[i - 1][j - 1]) / (power - 1);
            off = fmax(fabs(d[i][j] - d[i][j - 1]), fabs(d[i][j] - d[i - 1][j - 1]));
            if (off < error) error = off, best = d[i][j];
        }
    }
    return best;
}

static double dot(const double *a, const double *b, int n) {
    double sum = 0;
    int    i;
    for (i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

static void fill(double *a, int n, double size, unsigned seed) {
    int i;
    for (i = 0; i < n; i++) a[i] = size * noise(seed * 7919u + (unsigned)i);
}

/* out = a + eps d. */
static void shift(const double *a, const double *d, double eps, int n, double *out) {
    int i;
    for (i = 0; i < n; i++) out[i] = a[i] + eps * d[i];
}

/* --- targets --- */

enum { NV = 25, NT = 12 };

typedef struct aim {
    cloth_targets q;
    cloth_mesh   *mesh;
    int           face[NT];
    double        bary[3 * NT], target[3 * NV], weight[NV], x[3 * NV], d[3 * NV];
} aim;

static void aim_open(aim *a) {
    int i, k;
    memset(a, 0, sizeof *a);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 5, 5, 1, 1, &a->mesh)) exit(2);
    fill(a->x, 3 * NV, 1, 1);
    fill(a->d, 3 * NV, 1, 2);
    fill(a->target, 3 * NV, 1, 3);
    for (i = 0; i < NT; i++) {
        a->face[i] = i * 7 % a->mesh->nf;
        for (k = 0; k < 2; k++) a->bary[3 * i + k] = 0.3 + 0.2 * noise((unsigned)(50 * i + k));
        a->bary[3 * i + 2] = 1 - a->bary[3 * i] - a->bary[3 * i + 1];
    }
    for (i = 0; i < NV; i++) a->weight[i] = 0.5 + 0.5 * fabs(noise(90u + (unsigned)i));
    a->q = cloth_targets_default();
    a->q.nv = NV, a->q.nf = a->mesh->nf, a->q.faces = a->mesh->faces;
    a->q.n = NT, a->q.face = a->face, a->q.bary = a->bary, a->q.target = a->target;
    a->q.weight = a->weight;
}

static double aim_value(double eps, void *user) {
    aim   *a = (aim *)user;
    double y[3 * NV], loss = 0;
    shift(a->x, a->d, eps, 3 * NV, y);
    CHECK(cloth_loss_targets(&a->q, y, &loss, NULL) == CLOTH_OK);
    return loss;
}

static void targets(void) {
    aim    a;
    double g[3 * NV], want[3 * NV], loss = 1, sum;
    int    i, j, k;
    aim_open(&a);
    CHECK(!(fabs(a.q.beta - 0.2) > 0));
    for (i = 0; i < 3 * NV; i++) g[i] = want[i] = i;        /* both are added to */
    CHECK(cloth_loss_targets(&a.q, a.x, &loss, g) == CLOTH_OK);
    for (i = 0, sum = 1; i < NT; i++)                       /* once more, from the formula */
        for (k = 0; k < 3; k++) {
            const int *v = a.mesh->faces + 3 * a.face[i];
            double     d = -a.target[3 * i + k];
            for (j = 0; j < 3; j++) d += a.bary[3 * i + j] * a.x[3 * v[j] + k];
            sum += 0.2 * a.weight[i] * d * d;
            for (j = 0; j < 3; j++)
                want[3 * v[j] + k] += 0.4 * a.weight[i] * a.bary[3 * i + j] * d;
        }
    CHECK_REL(loss, sum, 1e-14);
    for (i = 0; i < 3 * NV; i++) CHECK_NEAR(g[i], want[i], 1e-13);
    for (i = 0; i < 3 * NV; i++) g[i] -= i;
    CHECK_REL(dot(g, a.d, 3 * NV), difference(aim_value, &a, 0.1), 1e-11);
    cloth_mesh_destroy(NULL, a.mesh);
}

/* One target a vertex; what is masked may hold anything. */
static void targets_masked(void) {
    aim    a;
    double g[3 * NV] = {0}, loss = 0, sum = 0;
    int    i;
    aim_open(&a);
    a.q.faces = NULL, a.q.face = NULL, a.q.bary = NULL;
    a.q.n = NV, a.q.beta = 3;
    a.weight[4] = 0, a.target[13] = HOST_NAN;
    CHECK(cloth_loss_targets(&a.q, a.x, &loss, g) == CLOTH_OK);
    for (i = 0; i < 3 * NV; i++) {
        const double d = i / 3 == 4 ? 0 : a.x[i] - a.target[i];
        sum += 3 * a.weight[i / 3] * d * d;
        CHECK_NEAR(g[i], 6 * a.weight[i / 3] * d, 1e-14);
    }
    CHECK_REL(loss, sum, 1e-14);
    CHECK_REL(dot(g, a.d, 3 * NV), difference(aim_value, &a, 0.1), 1e-11);
    a.q.faces = a.mesh->faces, a.q.face = a.face, a.q.bary = a.bary, a.q.n = NT;
    loss = sum = aim_value(0, &a);
    a.face[3] = -1;
    CHECK(aim_value(0, &a) < loss);
    cloth_mesh_destroy(NULL, a.mesh);
}

static void targets_refused(void) {
    aim    a;
    double g[3 * NV] = {0}, loss = 7;
    int    n, i;
    aim_open(&a);
    hooks = host_hooks(&told);
    for (n = 0; n < 13; n++) {
        static const cloth_status want[13] = {
            CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT, CLOTH_ERR_NONFINITE,
            CLOTH_ERR_NONFINITE, CLOTH_ERR_NONFINITE, CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT,
            CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT, CLOTH_ERR_NONFINITE, CLOTH_ERR_NONFINITE,
            CLOTH_ERR_ARGUMENT};
        cloth_targets q = a.q;
        aim           b = a;
        int           faces[3 * 64];
        memcpy(faces, a.mesh->faces, 3 * (size_t)a.mesh->nf * sizeof *faces);
        q.face = b.face, q.target = b.target, q.weight = b.weight, q.bary = b.bary;
        q.faces = faces, q.hooks = &hooks;
        host_forget(&told);
        if (n == 0) b.face[2] = q.nf;
        if (n == 1) b.face[2] = -2;
        if (n == 2) b.weight[1] = -1;
        if (n == 3) b.weight[1] = HOST_NAN;
        if (n == 4) b.target[3 * NT - 1] = HOST_INFINITY;
        if (n == 5) b.x[3 * a.mesh->faces[3 * b.face[2]]] = HOST_NAN;
        if (n == 6) q.target = NULL;
        if (n == 7) q.beta = -1;
        if (n == 8) faces[5] = NV;
        if (n == 9) q.faces = NULL;                         /* n is not nv then */
        if (n == 10) q.beta = HOST_NAN;
        if (n == 11) b.bary[4] = HOST_NAN;
        if (n == 12) b.weight[1] = -5e-324, q.beta = 0.2;   /* their product is 0 */
        CHECK(cloth_loss_targets(&q, b.x, &loss, g) == want[n]);
        CHECK(told.errors == 1 && strstr(told.text, "cloth_loss_targets"));
    }
    CHECK(cloth_loss_targets(NULL, a.x, &loss, g) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_loss_targets(&a.q, NULL, &loss, g) == CLOTH_ERR_ARGUMENT);
    for (i = 0; i < 3 * NV; i++) CHECK(!(fabs(g[i]) > 0));
    CHECK(!(fabs(loss - 7) > 0));
    cloth_mesh_destroy(NULL, a.mesh);
}

/* As a cloth_loss_fn: one line. */
typedef struct fit {
    aim         *a;
    int          last;
    double       loss;
    cloth_status status;
} fit;

static void fit_loss(int k, const double *x, const double *v, double *gx, double *gv, void *user) {
    fit *f = (fit *)user;
    (void)v, (void)gv;
    if (k == f->last) f->status = cloth_loss_targets(&f->a->q, x, &f->loss, gx);
}

/* Three steps of the aim's sheet, its start moved by eps; a tape, where it is asked for. */
static void fit_steps(const aim *a, double eps, scene *s, cloth_tape **tape) {
    cloth_pin pin = {0, CLOTH_AXIS_ALL};
    int       k;
    memset(s, 0, sizeof *s);
    s->desc = cloth_desc_default();
    cloth_desc_set_mesh(&s->desc, a->mesh);
    s->desc.npins = 1, s->desc.pins = &pin;
    s->desc.tolerance = 1e-12;
    if (cloth_model_create(&s->desc, &s->model) || cloth_sim_create(s->model, &s->sim)) exit(2);
    shift(a->mesh->x, a->d, 1e-2 * eps, 3 * NV, cloth_sim_state(s->sim)->x);
    cloth_sim_state_changed(s->sim);
    if (tape) CHECK(cloth_tape_create(s->sim, NULL, tape) == CLOTH_OK);
    for (k = 0; k < 3; k++) CHECK(cloth_step(s->sim, 0.01, NULL) == CLOTH_OK);
}

static double fit_value(double eps, void *user) {
    aim   *a = (aim *)user;
    scene  s;
    double loss = 0;
    fit_steps(a, eps, &s, NULL);
    CHECK(cloth_loss_targets(&a->q, cloth_sim_state(s.sim)->x, &loss, NULL) == CLOTH_OK);
    scene_close(&s);
    return loss;
}

static void targets_on_a_tape(void) {
    aim         a;
    fit         f;
    scene       s;
    cloth_grad  g;
    cloth_tape *tape = NULL;
    double      x0[3 * NV];
    aim_open(&a);
    fit_steps(&a, 0, &s, &tape);
    memset(&f, 0, sizeof f);
    f.a = &a, f.last = 3;
    memset(&g, 0, sizeof g);
    g.x0 = x0;
    CHECK(cloth_grad_backward(tape, fit_loss, &f, &g, NULL) == CLOTH_OK && f.status == CLOTH_OK);
    CHECK_REL(f.loss, fit_value(0, &a), 1e-12);
    CHECK_REL(1e-2 * dot(x0, a.d, 3 * NV), difference(fit_value, &a, 0.1), 1e-6);
    cloth_tape_destroy(tape);
    scene_close(&s);
    cloth_mesh_destroy(NULL, a.mesh);
}

/* --- nearest points --- */

static void corner_sum(const double *x, const double *b, double *p) {
    int k;
    for (k = 0; k < 3; k++) p[k] = b[0] * x[k] + b[1] * x[3 + k] + b[2] * x[6 + k];
}

/* A point of the triangle and a direction that leaves it there straight: of the normal cone. */
static void leave(const double *x, int what, unsigned seed, double *b, double *d) {
    double e[3], f[3], n[3], r[3];
    int    k, i = what % 3, j = (what + 1) % 3, l = (what + 2) % 3;
    clothi_sub3(x + 3, x, e);
    clothi_sub3(x + 6, x, f);
    clothi_cross3(e, f, n);
    memset(b, 0, 3 * sizeof *b);
    fill(d, 3, 1, seed);
    if (what == 0) {                        /* inside: along the normal */
        for (k = 0; k < 3; k++) b[k] = 0.05 + fabs(noise(seed + 70u + (unsigned)k));
        r[0] = b[0] + b[1] + b[2];
        for (k = 0; k < 3; k++) b[k] /= r[0], d[k] = n[k] * noise(seed);
    } else if (what < 4) {                  /* a side: outwards, and along the normal */
        b[i] = 0.1 + 0.4 * fabs(noise(seed + 80u)), b[j] = 1 - b[i];
        clothi_sub3(x + 3 * j, x + 3 * i, e);
        clothi_cross3(e, n, r);
        clothi_sub3(x + 3 * l, x + 3 * i, f);
        CHECK(clothi_dot3(r, f) < 0);
        for (k = 0; k < 3; k++) d[k] = r[k] * fabs(noise(seed + 3)) + n[k] * noise(seed + 4);
    } else {                                /* a corner: away from both others */
        b[i] = 1;
        clothi_sub3(x + 3 * j, x + 3 * i, e);
        clothi_sub3(x + 3 * l, x + 3 * i, f);
        for (k = 5; !(clothi_dot3(d, e) < 0 && clothi_dot3(d, f) < 0); k += 3)
            fill(d, 3, 1, seed * 31u + (unsigned)k);
    }
    r[0] = sqrt(clothi_dot3(d, d));
    for (k = 0; k < 3; k++) d[k] /= r[0];
}

static void nearest_triangle(void) {
    int    i, k, what, n = test_quick() ? 500 : 5000;
    double worst = 0, far = 0;
    for (i = 0; i < n; i++)
        for (what = 0; what < 7; what++) {
            double x[9], b[3], d[3], at[3], p[3], got[3], found[3], d2, size = 0.5 + fabs(noise(
                                                                            700u + (unsigned)i));
            fill(x, 9, 1, 1000u + (unsigned)i);
            if (i % 3 == 1)                                 /* very obtuse */
                for (k = 0; k < 3; k++) x[6 + k] = 0.5 * (x[k] + x[3 + k]) + 0.05 * x[6 + k];
            leave(x, what, (unsigned)(7 * i + what), b, d);
            corner_sum(x, b, at);
            for (k = 0; k < 3; k++) p[k] = at[k] + size * d[k];
            d2 = cloth_nearest_on_triangle(p, x, got);
            corner_sum(x, got, found);
            CHECK(got[0] >= 0 && got[1] >= 0 && got[2] >= 0);
            CHECK_NEAR(got[0] + got[1] + got[2], 1, 1e-15);
            worst = fmax(worst, fabs(d2 - size * size));
            for (k = 0; k < 3; k++) far = fmax(far, fabs(found[k] - at[k]));
        }
    printf("  nearest point off by at most %.1e, its squared distance by %.1e\n", far, worst);
    CHECK(worst < 1e-13 && far < 1e-9);     /* a point is known to the root of what d2 is */
}

/* Triangles without an area, and the error of clamped coordinates: no sampled point is nearer. */
static void nearest_flat(void) {
    static const double obtuse[9] = {0, 0, 0, 1, 0, 0, -1, 0.2, 0}, p[3] = {-0.6, -0.5, 0.1};
    double b[3], x[9], q[3], best, clamp[3] = {0, 0, 0}, sum = 0;
    int    i, j, k, n;
    for (n = 0; n < 40; n++) {
        best = HUGE_VAL;
        fill(x, 9, 1, 40u + (unsigned)n);
        for (k = 0; k < 3; k++) {
            x[6 + k] = x[k] + (n % 4 < 2 ? 0.3 : 1.7) * (x[3 + k] - x[k]);
            if (n % 4 == 0) x[3 + k] = x[k];
            if (n % 8 == 4) x[6 + k] = x[k];
        }
        fill(q, 3, 1, 400u + (unsigned)n);
        for (i = 0; i <= 100; i++)
            for (j = 0; j <= 100 - i; j++) {
                const double at[3] = {0.01 * i, 0.01 * j, 1 - 0.01 * (i + j)};
                double       y[3], d[3];
                corner_sum(x, at, y);
                clothi_sub3(y, q, d);
                best = fmin(best, clothi_dot3(d, d));
            }
        sum = cloth_nearest_on_triangle(q, x, b);
        CHECK(sum <= best + 1e-14 && sqrt(best) - sqrt(sum) < 0.03);
        CHECK_NEAR(b[0] + b[1] + b[2], 1, 1e-15);
    }
    (void)cloth_nearest_on_triangle(p, obtuse, b);          /* on the side 0, 2: t = 0.5/1.04 */
    CHECK_NEAR(b[2], 0.5 / 1.04, 1e-15);
    CHECK(!(fabs(b[1]) > 0));
    clamp[2] = fmax(0, p[1] / 0.2), clamp[1] = fmax(0, p[0] + clamp[2]);
    CHECK(!(clamp[2] > 0) && fabs(b[2] - clamp[2]) > 0.4);  /* clamped it is a corner */
}

/* Beyond what squares can say there is a point all the same. */
static void nearest_huge(void) {
    const double x[9] = {0, 0, 0, 1e160, 0, 0, 0, 1e160, 0}, p[3] = {3e159, 2e159, 1e160};
    const int    corners[3] = {0, 1, 2};
    double       b[3] = {-7, -7, -7};
    int          face = 9;
    CHECK(cloth_nearest_on_mesh(NULL, 3, x, 1, corners, 1, p, HUGE_VAL, &face, b) == CLOTH_OK);
    CHECK(face == 0 && b[0] >= 0 && b[1] >= 0 && b[2] >= 0);
    CHECK_NEAR(b[0] + b[1] + b[2], 1, 1e-15);
}

static void nearest_mesh(void) {
    enum { N = 60 };
    double      point[3 * N], bary[3 * N], b[3], x[9], best, d2;
    int         face[N], i, f, k, none = 0;
    cloth_mesh *m = NULL;
    if (cloth_mesh_tube(NULL, 0.3, 0.8, 12, 8, &m)) exit(2);
    fill(point, 3 * N, 0.7, 5);
    memcpy(point, m->x + 30, 3 * sizeof *point);            /* a vertex: its faces are as near */
    CHECK(cloth_nearest_on_mesh(NULL, m->nv, m->x, m->nf, m->faces, N, point, 0.35, face, bary) ==
          CLOTH_OK);
    for (i = 0; i < N; i++) {
        int want = -1;
        for (f = 0, best = HUGE_VAL; f < m->nf; f++) {
            for (k = 0; k < 9; k++) x[k] = m->x[3 * m->faces[3 * f + k / 3] + k % 3];
            d2 = cloth_nearest_on_triangle(point + 3 * i, x, b);
            if (d2 < best) best = d2, want = f;
        }
        if (best > 0.35 * 0.35) want = -1;
        CHECK(face[i] == want);
        none += want < 0;
        d2 = bary[3 * i] + bary[3 * i + 1] + bary[3 * i + 2];
        CHECK_NEAR(d2, want < 0 ? 0 : 1, 1e-14);
    }
    CHECK(none > 5 && none < N - 5);
    hooks = host_hooks(&told);
    CHECK(cloth_nearest_on_mesh(&hooks, m->nv, m->x, m->nf, m->faces, N, point, -1, face, bary) ==
          CLOTH_ERR_ARGUMENT && told.errors == 1);
    CHECK(cloth_nearest_on_mesh(&hooks, 3, m->x, m->nf, m->faces, N, point, 1, face, bary) ==
          CLOTH_ERR_ARGUMENT && told.errors == 2);
    CHECK(cloth_nearest_on_mesh(&hooks, m->nv, m->x, m->nf, m->faces, N, NULL, 1, face, bary) ==
          CLOTH_ERR_ARGUMENT && told.errors == 3);
    point[7] = HOST_NAN;
    CHECK(cloth_nearest_on_mesh(&hooks, m->nv, m->x, m->nf, m->faces, N, point, 1, face, bary) ==
          CLOTH_ERR_NONFINITE && told.errors == 4);
    CHECK(cloth_nearest_on_mesh(&hooks, 0, NULL, 0, NULL, 0, NULL, 1, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_nearest_on_mesh(&hooks, 0, NULL, 0, NULL, 2, point, 1, face, bary) == CLOTH_OK &&
          face[0] == -1 && face[1] == -1);
    cloth_mesh_destroy(NULL, m);
}

/* The distance itself, its nearest points found anew, has the derivative of the targets. */
static double nearest_value(double eps, void *user) {
    aim   *a = (aim *)user;
    double y[3 * NV], loss = 0;
    shift(a->x, a->d, eps, 3 * NV, y);
    CHECK(cloth_nearest_on_mesh(NULL, NV, y, a->q.nf, a->q.faces, NT, a->target, HUGE_VAL, a->face,
                                a->bary) == CLOTH_OK);
    CHECK(cloth_loss_targets(&a->q, y, &loss, NULL) == CLOTH_OK);
    return loss;
}

static void nearest_derivative(void) {
    aim    a;
    double g[3 * NV] = {0}, want;
    aim_open(&a);
    fill(a.d, 3 * NV, 0.01, 9);
    want = difference(nearest_value, &a, 0.1);
    (void)nearest_value(0, &a);
    CHECK(cloth_loss_targets(&a.q, a.x, NULL, g) == CLOTH_OK);
    CHECK_REL(dot(g, a.d, 3 * NV), want, 1e-8);
    cloth_mesh_destroy(NULL, a.mesh);
}

/* --- the simulation layer --- */

enum { FRAMES = 5, ROOM = 3 * 40 };

typedef struct film {                       /* frames of a hanging sheet of 5 x 5              */
    scene       s;
    cloth_layer o;
    double      x[FRAMES * ROOM], d[FRAMES * ROOM], g[FRAMES * ROOM], y[FRAMES * ROOM];
    int          n, fails, floats;          /* n: 3 nv; fails: frame whose place() refuses;
                                               floats: from frame 1 on nothing has weight      */
    cloth_status with;                      /* what it says                                    */
    cloth_collide *c;
    cloth_obstacle body;
    double      at[3], speed;               /* of the body                                     */
} film;

/* Frames that the kit makes itself from the sim's state on, which stays where it was. */
static void film_shoot(film *f) {
    static unsigned char home[1 << 18];
    const size_t         size = cloth_sim_save_size(f->s.sim);
    int                  k;
    if (size > sizeof home || 3 * f->s.nv > ROOM) exit(2);
    f->n = 3 * f->s.nv;
    CHECK(cloth_sim_save(f->s.sim, home, size) == CLOTH_OK);
    for (k = 0; k < FRAMES; k++) {
        if (k && f->o.place) CHECK(f->o.place(f->s.sim, k, 0, f) == CLOTH_OK);
        if (k) CHECK(cloth_step(f->s.sim, f->o.h, NULL) == CLOTH_OK);
        memcpy(f->x + k * f->n, cloth_sim_state(f->s.sim)->x, (size_t)f->n * sizeof(double));
    }
    CHECK(cloth_sim_restore(f->s.sim, home, size) == CLOTH_OK);
    fill(f->d, FRAMES * f->n, 1e-3, 17);
}

static double film_tolerance = 1e-12;

static void film_open(film *f, cloth_integrator by, int substeps, int with,
                      const cloth_hooks *h) {
    int i;
    memset(f, 0, sizeof *f);
    scene_desc(&f->s, 5, h, with);
    f->s.desc.integrator = by;
    f->s.desc.substeps = substeps;
    f->s.desc.tolerance = film_tolerance;
    f->s.desc.cg_tolerance = 1e-4;
    if (scene_open(&f->s, with)) exit(2);
    f->o = cloth_layer_default();
    f->o.h = 1.0 / 60;
    f->o.x = f->x;
    f->o.user = f;
    f->fails = -1;
    for (i = 0; i < 3 * f->s.nv; i++)
        cloth_sim_state(f->s.sim)->v[i] = 0.1 * noise(333u + (unsigned)i);
    cloth_sim_state_changed(f->s.sim);
    film_shoot(f);
}

static void film_close(film *f) {
    cloth_collide_destroy(f->c);
    scene_close(&f->s);
}

static double film_value(double eps, void *user) {
    film        *f = (film *)user;
    cloth_layer  o = f->o;
    double       x[FRAMES * ROOM], loss = 0;
    shift(f->x, f->d, eps, FRAMES * f->n, x);
    o.x = x;
    CHECK(cloth_layer_loss(f->s.sim, &o, &loss, NULL, NULL) == CLOTH_OK);
    return loss;
}

/* Gradient against differences; the sim stays where it was. */
static cloth_layer_report film_check(film *f, const char *what, double bound) {
    const uint64_t     before = cloth_sim_hash(f->s.sim);
    cloth_layer_report r;
    double             loss = 2, a, b;
    int                i;
    for (i = 0; i < FRAMES * f->n; i++) f->g[i] = i;        /* both are added to */
    CHECK(cloth_layer_loss(f->s.sim, &f->o, &loss, f->g, &r) == CLOTH_OK);
    for (i = 0; i < FRAMES * f->n; i++) f->g[i] -= i;
    CHECK(cloth_sim_hash(f->s.sim) == before);
    CHECK(r.grad.valid && r.grad.step == -1 && !*r.grad.why);
    if (!r.grad.valid) printf("  %s: %s, frame %d\n", what, r.grad.why, r.grad.step);
    a = dot(f->g, f->d, FRAMES * f->n), b = difference(film_value, f, 0.2);
    CHECK(cloth_sim_hash(f->s.sim) == before);
    CHECK_NEAR(loss - 2, film_value(0, f), 1e-10 * loss);
    if (test_full()) printf("  %-24s %17.10e %17.10e  %.1e\n", what, a, b, fabs(a / b - 1));
    CHECK_REL(a, b, bound);
    return r;
}

static void layer_differences(void) {
    static const cloth_integrator by[3] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_BDF2,
                                           CLOTH_INTEGRATOR_LEAPFROG};
    static const char *const name[3] = {"euler", "bdf2", "leapfrog"};
    static film        f;
    cloth_layer_report r;
    int                i, back, k;
    for (i = 0; i < (test_quick() ? 2 : 3); i++)
        for (back = 0; back < 2; back++) {
            film_open(&f, by[i], i == 0 ? back : i == 1 ? 2 : 60, WITH_PINS | WITH_DAMPING, NULL);
            shift(f.x, f.d, 3, FRAMES * f.n, f.x);          /* 3 mm of noise */
            fill(f.d, FRAMES * f.n, 1e-3, 29);
            f.o.backward = back;
            r = film_check(&f, name[i], 1e-6);
            CHECK(r.used == FRAMES - 1 - back && r.failed == 0 && r.beyond == 0 && r.starts == 1);
            CHECK(r.first_failed == -1 && r.worst > 1e-3 && r.grad.steps == r.used);
            for (k = 0; k < FRAMES; k++) CHECK(dot(f.g + k * f.n, f.g + k * f.n, f.n) > 0);
            film_close(&f);
        }
}

/* The first frame is where the sim is, whose attachment is where it was made: its pose stays when
 * the frame moves. */
static void layer_attached(void) {
    static film f;
    film_open(&f, CLOTH_INTEGRATOR_EULER, 2, WITH_PINS | WITH_ATTACH, NULL);
    shift(f.x + f.n, f.d, 3, (FRAMES - 1) * f.n, f.x + f.n);
    (void)film_check(&f, "attached", 1e-6);
    film_close(&f);
}

/* A host's steps: frame k takes k of them, the last one fails after the first of its own. */
static cloth_status film_strides(cloth_sim *sim, double h, void *user) {
    const film  *f = (const film *)user;
    const int    frame = 1 + (int)(cloth_sim_state(sim)->t / h + 0.5);
    cloth_status status = CLOTH_OK;
    int          i;
    for (i = 0; i < frame && !status; i++)
        status = i == 1 && frame == f->fails ? CLOTH_ERR_STEP : cloth_step(sim, h / frame, NULL);
    return status;
}

static void layer_strides(void) {
    static film        f;
    cloth_layer_report r;
    int                i;
    for (i = 0; i < 2; i++) {
        film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS | WITH_DAMPING, NULL);
        shift(f.x, f.d, 3, FRAMES * f.n, f.x);
        fill(f.d, FRAMES * f.n, 1e-3, 31);
        f.o.step = film_strides;
        if (i) f.fails = FRAMES - 1;
        r = film_check(&f, i ? "strides, one fails" : "strides", 1e-6);
        CHECK(r.used == FRAMES - 1 - i && r.failed == i && r.starts == 1);
        CHECK(r.first_failed == (i ? FRAMES - 1 : -1) && r.grad.steps == (i ? 7 : 10));
        CHECK(i == (dot(f.g + (FRAMES - 1) * f.n, f.g + (FRAMES - 1) * f.n, f.n) <= 0));
        film_close(&f);
    }
}

/* Frames that the kit made; at rest; in free fall, where forward differences are off by k g h^2. */
static void layer_own_frames(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0, want = 0, h2;
    int                i, k;
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS | WITH_DAMPING, NULL);
    f.o.backward = 1, f.o.y = f.y;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_OK && r.used == FRAMES - 2);
    CHECK(loss < 1e-14 && r.worst < 1e-9);
    for (i = 0; i < FRAMES * f.n; i++) CHECK_NEAR(f.y[i], f.x[i], 1e-9);
    CHECK(cloth_solve_static(f.s.sim, NULL) == CLOTH_OK);
    for (k = 0; k < FRAMES; k++)
        memcpy(f.x + k * f.n, cloth_sim_state(f.s.sim)->x, (size_t)f.n * sizeof(double));
    for (f.o.backward = 0; f.o.backward < 2; f.o.backward++) {
        loss = 0;
        CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, NULL, &r) == CLOTH_OK && loss < 1e-12);
    }
    film_close(&f);
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, 0, NULL);
    for (i = 0; i < f.n; i++) cloth_sim_state(f.s.sim)->v[i] = 0.3 * (i % 3);
    cloth_sim_state_changed(f.s.sim);
    film_shoot(&f);
    h2 = 9.81 * f.o.h * f.o.h;
    for (k = 1; k < FRAMES; k++) want += 20000 * (k * h2) * (k * h2);
    loss = 0;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, NULL, &r) == CLOTH_OK);
    CHECK_REL(loss, want, 1e-8);
    CHECK_REL(r.worst, 4 * h2, 1e-8);
    film_close(&f);
}

static void film_heard(void *user, const cloth_step_record *r) {
    (void)r;
    ++*(int *)user;
}

/* History does not matter, a recorder hears nothing, doubts bear the number of their frame. */
static void layer_apart(void) {
    static film        f;
    cloth_layer_report r;
    cloth_recorder     ear;
    cloth_tape_options t = cloth_tape_options_default();
    double             with = 0, without = 0;
    int                heard = 0;
    film_open(&f, CLOTH_INTEGRATOR_BDF2, 0, WITH_PINS, NULL);
    CHECK(cloth_step(f.s.sim, f.o.h, NULL) == CLOTH_OK);
    memset(&ear, 0, sizeof ear);
    ear.user = &heard, ear.step = film_heard;
    CHECK(cloth_sim_set_recorder(f.s.sim, &ear) == CLOTH_OK);
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &with, f.g, &r) == CLOTH_OK && heard == 0);
    cloth_sim_state_changed(f.s.sim);
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &without, NULL, &r) == CLOTH_OK && with > 0);
    CHECK(!(fabs(with - without) > 0));
    CHECK(cloth_step(f.s.sim, f.o.h, NULL) == CLOTH_OK && heard == 1);
    film_close(&f);
    film_tolerance = 1e-4;
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS, NULL);
    film_tolerance = 1e-12;
    shift(f.x, f.d, 3, FRAMES * f.n, f.x);
    t.early = 1e-9, f.o.tape = &t;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, NULL, f.g, &r) == CLOTH_OK && !r.grad.valid);
    CHECK(r.grad.doubt == CLOTH_GRAD_EARLY && r.grad.step == 1 && *r.grad.why);
    film_close(&f);
}

/* --- frames that fail --- */

static cloth_status film_refuse(cloth_sim *sim, int frame, int start, void *user) {
    film        *f = (film *)user;
    const double t = cloth_sim_state(sim)->t;               /* frame 0 is now */
    CHECK_NEAR(t, f->o.h * (start ? frame : frame - 1), 1e-12);
    if (f->floats && frame == 1 && !start) {
        const double none[3] = {0, 0, 0};
        CHECK(cloth_sim_set_gravity(sim, none) == CLOTH_OK);
    }
    return frame == f->fails && !start ? f->with : CLOTH_OK;
}

/* The loss is that of what lies before and after, the gradient too. */
static void layer_failures(void) {
    static film        f;
    static double      g[FRAMES * ROOM];
    cloth_layer_report r;
    double             loss = 0, parts = 0;
    int                i;
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS, NULL);
    f.o.place = film_refuse;
    f.fails = 2, f.with = CLOTH_ERR_STEP, f.floats = 1;
    r = film_check(&f, "one that fails", 1e-6);
    CHECK(r.used == 3 && r.failed == 1 && r.beyond == 0 && r.starts == 2 && r.first_failed == 2);
    CHECK(r.failure == CLOTH_ERR_STEP && r.grad.steps == 3);
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, NULL, &r) == CLOTH_OK);
    f.fails = -1, f.o.frames = 2;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &parts, g, &r) == CLOTH_OK && r.used == 1);
    f.o.frames = 3, f.o.x = f.x + 2 * f.n, f.floats = 0;    /* each run starts from the sim */
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &parts, g + 2 * f.n, &r) == CLOTH_OK && r.used == 2);
    CHECK_REL(loss, parts, 1e-12);
    for (i = 0; i < FRAMES * f.n; i++) CHECK_NEAR(g[i], f.g[i], 1e-9 * (1 + fabs(g[i])));
    f.o.frames = FRAMES, f.o.x = f.x;
    for (i = 1; i < FRAMES; i++) {          /* each of them, and with the other difference */
        f.fails = i, f.o.backward = 0;
        CHECK(cloth_layer_loss(f.s.sim, &f.o, NULL, NULL, &r) == CLOTH_OK);
        CHECK(r.used == 3 && r.failed == 1 && r.starts == (i < FRAMES - 1 ? 2 : 1));
        f.o.backward = 1;
        CHECK(cloth_layer_loss(f.s.sim, &f.o, NULL, NULL, &r) == CLOTH_OK);
        CHECK(r.used == (i > 1 ? 2 : 3) && r.used + r.failed == 3);
    }
    f.o.backward = 0, f.fails = 3, f.with = CLOTH_ERR_HANDLE;
    loss = 5;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_ERR_HANDLE);
    CHECK(!(fabs(loss - 5) > 0) && r.status == CLOTH_ERR_HANDLE);
    film_close(&f);
}

/* The report of a layer: the worst of its runs, and the sums of what they cost. */
static void layer_reports(void) {
    cloth_layer        o = cloth_layer_default();
    cloth_layer_report r;
    cloth_grad_report  q;
    clothi_layer       l;
    int                k;
    memset(&l, 0, sizeof l);
    memset(&r, 0, sizeof r);
    l.o = &o, l.r = &r, r.grad.margin = HUGE_VAL;
    for (k = 1; k <= 3; k++) {              /* the second run is the worst */
        memset(&q, 0, sizeof q);
        q.residual = k == 2 ? 1e-3 : 1e-6, q.left_m = k == 2 ? 1e-4 : 1e-9;
        q.bytes = k == 2 ? 500 : 100, q.solves = k, q.early = 0.5;
        q.margin = k == 2 ? 1e-5 : HUGE_VAL, q.rows = 10 * k, q.redundant = k;
        clothi_layer_merge(&l, &q);
    }
    CHECK_NEAR(r.grad.residual, 1e-3, 0);
    CHECK_NEAR(r.grad.left_m, 1e-4, 0);
    CHECK(r.grad.bytes == 500 && r.grad.solves == 6 && r.grad.valid);
    CHECK_NEAR(r.grad.margin, 1e-5, 0);
    CHECK(r.grad.rows == 60 && r.grad.redundant == 6);
    CHECK_NEAR(r.grad.early, 1.5, 0);
}

/* A prediction out of the way is skipped, and so is what is simulated from it. */
static void layer_far(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0;
    int                i;
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, 0, NULL);
    for (i = 0; i < f.n; i++) f.x[2 * f.n + i] += 0.2;
    f.o.y = f.y;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_OK);
    CHECK(r.used == 2 && r.failed == 2 && r.beyond == 2 && r.starts == 2 && r.first_failed == 2);
    CHECK(r.failure == CLOTH_OK && r.worst < 0.1);          /* 2, and 4 by the difference 2 to 3 */
    for (i = 0; i < f.n; i++) CHECK(!(fabs(f.y[2 * f.n + i] - f.x[2 * f.n + i]) > 0));
    fill(f.d, FRAMES * f.n, 1e-3, 31);
    r = film_check(&f, "far ones", 1e-6);
    f.o.most = 1e-9;                         /* none is near enough */
    memset(f.g, 0, sizeof f.g);
    loss = 0;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_OK);
    CHECK(r.used == 0 && r.failed == 4 && r.beyond == 4 && r.starts == 4 && !(loss > 0));
    CHECK(r.grad.valid && !r.grad.doubt);   /* all zeros, and they are right */
    for (i = 0; i < FRAMES * f.n; i++) CHECK(!(fabs(f.g[i]) > 0));
    film_close(&f);
}

/* Steps that have no result of themselves: LEAPFROG beyond its limit. */
static void layer_no_step(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0;
    hooks = host_hooks(&told);
    film_open(&f, CLOTH_INTEGRATOR_LEAPFROG, 60, WITH_PINS, &hooks);
    f.o.h = 0.5;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_OK);
    CHECK(r.used == 0 && r.failed == 4 && r.beyond == 0 && r.failure == CLOTH_ERR_STEP);
    CHECK(!(loss > 0) && told.errors > 0);
    film_close(&f);
    CHECK(told.live == 0);
}

/* --- with contact: a sheet on a ball that moves --- */

static cloth_status film_body(cloth_sim *sim, int frame, int start, void *user) {
    film  *f = (film *)user;
    double x[3];
    (void)sim;
    memcpy(x, f->at, sizeof x);
    x[0] += f->speed * frame * f->o.h;
    return start ? cloth_collide_teleport(f->c, f->body, x)
                 : cloth_collide_move(f->c, f->body, x);
}

static void film_touch(film *f, cloth_initial initial) {
    cloth_collide_desc  k = cloth_collide_desc_default();
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    int                 i;
    memset(f, 0, sizeof *f);
    scene_desc(&f->s, 5, NULL, 0);
    f->s.desc.contact = CLOTH_CONTACT_OBSTACLES;
    f->s.desc.tolerance = 1e-12;
    f->s.desc.cg_tolerance = 1e-4;
    f->s.desc.linear = CLOTH_LINEAR_CHOLESKY;
    if (scene_open(&f->s, WITH_PINS)) exit(2);
    k.thickness = 4e-3, k.stiffness = 2e5, k.slip = 1e-4, k.initial = initial;
    CHECK(cloth_collide_create(f->s.sim, &k, &f->c) == CLOTH_OK);
    for (i = 0; i < 3; i++) f->at[i] = f->s.mesh->x[3 * 12 + i];
    f->at[1] -= 0.152, f->speed = 0.2;
    d.kind = CLOTH_OBSTACLE_SPHERE, d.radius = 0.15, d.x = f->at, d.friction = 0.3;
    CHECK(cloth_collide_add(f->c, &d, &f->body) == CLOTH_OK);
    f->o = cloth_layer_default();
    f->o.h = 0.01;
    f->o.x = f->x;
    f->o.user = f;
    f->o.place = film_body;
    film_shoot(f);
}

static void layer_contact(void) {
    static film        f;
    cloth_layer_report r;
    cloth_report       step;
    int                back;
    film_touch(&f, CLOTH_INITIAL_REFUSE);
    shift(f.x, f.d, 0.1, FRAMES * f.n, f.x);                /* 0.1 mm of noise */
    for (back = 0; back < 2; back++) {
        f.o.backward = back;
        fill(f.d, FRAMES * f.n, 1e-5, 37);
        r = film_check(&f, "contact", 1e-4);
        CHECK(r.used == FRAMES - 1 - back && r.starts == 1);
    }
    CHECK(cloth_step(f.s.sim, f.o.h, &step) == CLOTH_OK && step.contacts > 0);
    film_close(&f);
}

/* The first frames are in the ball: refused, unless the host lets them in. */
static void layer_intersecting(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0;
    int                i, k;
    for (k = 0; k < 2; k++) {
        film_touch(&f, k ? CLOTH_INITIAL_EXEMPT : CLOTH_INITIAL_REFUSE);
        for (i = 0; i < 2 * f.n; i++)
            if (i % 3 == 1) f.x[i] -= 0.01;
        CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_OK);
        CHECK(r.used == (k ? 4 : 2) && r.starts == (k ? 1 : 3) && r.failed == (k ? 0 : 2));
        CHECK(r.failure == (k ? CLOTH_OK : CLOTH_ERR_MESH) && r.grad.valid);
        fill(f.d, FRAMES * f.n, 1e-5, 41);
        (void)film_check(&f, k ? "exempt pairs" : "refused pairs", 1e-4);
        film_close(&f);
    }
}

/* --- what it refuses, and memory --- */

static void layer_refused(void) {
    static film        f;
    cloth_layer_report r;
    cloth_tape        *tape = NULL;
    cloth_tape_options t = cloth_tape_options_default();
    double             loss = 3;
    uint64_t           before;
    int                n, i;
    hooks = host_hooks(&told);
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS, &hooks);
    before = cloth_sim_hash(f.s.sim);
    for (n = 0; n < 10; n++) {
        static const cloth_status want[10] = {
            CLOTH_ERR_UNINIT, CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT,
            CLOTH_ERR_ARGUMENT, CLOTH_ERR_NONFINITE, CLOTH_ERR_ARGUMENT, CLOTH_ERR_ARGUMENT,
            CLOTH_ERR_NONFINITE, CLOTH_ERR_CAPACITY};
        cloth_layer  o = f.o;
        const double keep = f.x[2 * f.n + 7];
        host_forget(&told);
        if (n == 0) o.cookie = 0;
        if (n == 1) o.frames = 1;
        if (n == 2) o.frames = 2, o.backward = 1;
        if (n == 3) o.h = 0;
        if (n == 4) o.most = 0;
        if (n == 5) o.beta = HOST_INFINITY;
        if (n == 6) o.x = NULL;
        if (n == 7) CHECK(cloth_tape_create(f.s.sim, NULL, &tape) == CLOTH_OK);
        if (n == 8) f.x[2 * f.n + 7] = HOST_NAN;
        if (n == 9) t.bytes = 10, o.tape = &t;
        CHECK(cloth_layer_loss(f.s.sim, &o, &loss, f.g, &r) == want[n] && r.status == want[n]);
        CHECK(told.errors == 1 && cloth_sim_hash(f.s.sim) == before);
        cloth_tape_destroy(tape);
        tape = NULL;
        f.x[2 * f.n + 7] = keep;
    }
    CHECK(cloth_layer_loss(NULL, &f.o, &loss, f.g, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_layer_loss(f.s.sim, NULL, &loss, f.g, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(!(fabs(loss - 3) > 0));
    for (i = 0; i < FRAMES * f.n; i++) CHECK(!(fabs(f.g[i]) > 0));
    film_close(&f);
    CHECK(told.live == 0);
}

/* place() does what ends a tape. */
static cloth_status film_meddle(cloth_sim *sim, int frame, int start, void *user) {
    (void)user;
    if (frame == 3 && !start) cloth_sim_state(sim)->v[0] += 1;
    return CLOTH_OK;
}

static void layer_meddled(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0;
    hooks = host_hooks(&told);
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS, &hooks);
    f.o.place = film_meddle;
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(strstr(told.text, "before frame 3") && !(loss > 0));
    film_close(&f);
}

/* place() takes the body away that the sim is to have again: no memory was wanting. */
static cloth_status film_remove(cloth_sim *sim, int frame, int start, void *user) {
    film *f = (film *)user;
    (void)sim;
    return frame == f->fails && !start ? cloth_collide_remove(f->c, f->body) : CLOTH_OK;
}

static void layer_without_body(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0;
    int                i;
    for (i = 0; i < 4; i++) {
        film_touch(&f, CLOTH_INITIAL_REFUSE);
        f.o.place = film_remove, f.fails = 2;
        if (i > 1) f.o.most = 1e-30;        /* the next run begins without it */
        CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, i % 2 ? f.g : NULL, &r) == CLOTH_ERR_ARGUMENT);
        CHECK(r.status == CLOTH_ERR_ARGUMENT && !(fabs(loss) > 0));
        film_close(&f);
    }
}

/* A host's step() that makes none says so: no frame is compared with what did not move. */
static cloth_status film_pause(cloth_sim *sim, double h, void *user) {
    const int frame = 1 + (int)(cloth_sim_state(sim)->t / h + 0.5);
    (void)user;
    return frame == 2 ? CLOTH_OK : cloth_step(sim, h, NULL);
}

static void layer_paused(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0;
    int                i;
    hooks = host_hooks(&told);
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS, &hooks);
    f.o.step = film_pause;
    for (i = 0; i < 2; i++)
        CHECK(cloth_layer_loss(f.s.sim, &f.o, &loss, i ? f.g : NULL, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(strstr(told.text, "none to frame 2") && !(loss > 0));
    film_close(&f);
}

/* The n-th allocation fails, n = 1, 2, ..: nothing is added or lost, and the next call works. */
static void layer_memory(void) {
    static film        f;
    cloth_layer_report r;
    double             loss = 0, want = 0;
    uint64_t           before;
    int                n, live, failed = 0;
    hooks = host_hooks(&told);
    film_open(&f, CLOTH_INTEGRATOR_EULER, 0, WITH_PINS, &hooks);
    before = cloth_sim_hash(f.s.sim);
    CHECK(cloth_layer_loss(f.s.sim, &f.o, &want, f.g, NULL) == CLOTH_OK);
    live = told.live;
    for (n = 1; n < 400; n++) {
        cloth_status status;
        told.fail_at = told.calls + n;
        loss = 0;
        memset(f.g, 0, sizeof f.g);
        status = cloth_layer_loss(f.s.sim, &f.o, &loss, f.g, &r);
        told.fail_at = 0;
        CHECK(cloth_sim_hash(f.s.sim) == before && told.live == live);
        if (status == CLOTH_OK) break;
        CHECK(status == CLOTH_ERR_MEMORY && !(loss > 0) && !(dot(f.g, f.g, f.n) > 0));
        failed++;
    }
    CHECK(failed > 12 && failed < 399 && !(fabs(loss - want) > 0));
    printf("  %d allocations failed in turn\n", failed);
    film_close(&f);
    CHECK(told.live == 0);
}

/* --- the embedded graph --- */

enum { GN = 7, GK = 3, GV = 130 };

typedef struct web {
    cloth_graph *g;
    cloth_mesh  *mesh;
    double       p[6 * GN], d[6 * GN], dX[3 * GV], X[3 * GV], a[3 * GV], beta;
    int          by_X;
} web;

/* A tube, so that nodes are not in a plane; `turn` is the size of rotations. */
static void web_open(web *w, double turn, unsigned seed) {
    int i;
    memset(w, 0, sizeof *w);
    if (cloth_mesh_tube(NULL, 0.3, 0.8, 12, 8, &w->mesh) || w->mesh->nv > GV) exit(2);
    CHECK(cloth_graph_create(NULL, w->mesh->nv, w->mesh->x, GN, GK, 3, &w->g) == CLOTH_OK);
    if (!w->g) exit(2);
    fill(w->p, 6 * GN, 0.3, seed);
    for (i = 0; i < 6 * GN; i++) w->p[i] *= i % 6 < 3 ? turn / 0.3 : 1;
    fill(w->d, 6 * GN, 1, seed + 1);
    fill(w->dX, 3 * GV, 1, seed + 2);
    fill(w->a, 3 * GV, 1, seed + 3);
    memcpy(w->X, w->mesh->x, 3 * (size_t)w->mesh->nv * sizeof(double));
    w->beta = 2;
}

static void web_close(web *w) {
    cloth_graph_destroy(NULL, w->g);
    cloth_mesh_destroy(NULL, w->mesh);
}

static double web_value(double eps, void *user) {
    web   *w = (web *)user;
    double p[6 * GN], X[3 * GV], x[3 * GV];
    shift(w->p, w->d, w->by_X ? 0 : eps, 6 * GN, p);
    shift(w->X, w->dX, w->by_X ? eps : 0, 3 * w->g->nv, X);
    CHECK(cloth_graph_deform(NULL, w->g, X, p, x) == CLOTH_OK);
    return dot(x, w->a, 3 * w->g->nv);
}

static double web_stiffness(double eps, void *user) {
    web   *w = (web *)user;
    double p[6 * GN], loss = 0;
    shift(w->p, w->d, eps, 6 * GN, p);
    CHECK(cloth_graph_rigidity(NULL, w->g, p, w->beta, &loss, NULL) == CLOTH_OK);
    return loss;
}

/* Rotations of every size: 0, where series and closed form meet, beyond a turn. */
static void graph_derivatives(void) {
    static const double turn[7] = {0, 1e-9, 1e-3, 0.28, 0.3, 2, 9};
    double              worst = 0;
    unsigned            i;
    for (i = 0; i < 7; i++) {
        double g_p[6 * GN], g_X[3 * GV], g[6 * GN] = {0}, loss = 1, a, b;
        web    w;
        int    k;
        web_open(&w, turn[i], 100 + 10 * i);
        for (k = 0; k < 6 * GN; k++) g_p[k] = k;            /* both are added to */
        for (k = 0; k < 3 * GV; k++) g_X[k] = k;
        CHECK(cloth_graph_vjp(NULL, w.g, w.X, w.p, w.a, g_p, g_X) == CLOTH_OK);
        for (k = 0; k < 6 * GN; k++) g_p[k] -= k;
        for (k = 0; k < 3 * GV; k++) g_X[k] -= k;
        a = dot(g_p, w.d, 6 * GN), b = difference(web_value, &w, 0.1);
        worst = fmax(worst, fabs(a / b - 1));
        w.by_X = 1;
        a = dot(g_X, w.dX, 3 * w.g->nv), b = difference(web_value, &w, 0.1);
        worst = fmax(worst, fabs(a / b - 1));
        CHECK(cloth_graph_rigidity(NULL, w.g, w.p, w.beta, &loss, g) == CLOTH_OK);
        CHECK_REL(loss - 1, web_stiffness(0, &w), 1e-12);
        a = dot(g, w.d, 6 * GN), b = difference(web_stiffness, &w, 0.1);
        worst = fmax(worst, fabs(a / b - 1));
        web_close(&w);
    }
    printf("  derivatives off by at most %.1e\n", worst);
    CHECK(worst < 1e-10);
}

/* At r = 0 the derivative by r is the moment of the forces about the node: no limit is taken. */
static void graph_at_rest(void) {
    double g_p[6 * GN] = {0}, x[3 * GV], m[3], want[3], arm[3];
    web    w;
    int    i, j, k;
    web_open(&w, 0, 5);
    memset(w.p, 0, sizeof w.p);
    CHECK(cloth_graph_deform(NULL, w.g, w.X, w.p, x) == CLOTH_OK);
    for (i = 0; i < 3 * w.g->nv; i++) CHECK_NEAR(x[i], w.X[i], 1e-15);
    CHECK(cloth_graph_vjp(NULL, w.g, w.X, w.p, w.a, g_p, NULL) == CLOTH_OK);
    for (j = 0; j < GN; j++) {
        memset(want, 0, sizeof want);
        for (i = w.g->start[j]; i < w.g->start[j + 1]; i++) {
            clothi_sub3(w.X + 3 * w.g->vertex[i], w.g->g + 3 * j, arm);
            clothi_cross3(arm, w.a + 3 * w.g->vertex[i], m);
            for (k = 0; k < 3; k++) want[k] += w.g->weight[i] * m[k];
        }
        for (k = 0; k < 3; k++) CHECK_NEAR(g_p[6 * j + k], want[k], 1e-13);
    }
    web_close(&w);
}

/* All nodes turned alike about the origin: X turned, and nothing is strained. */
static void graph_rigid(void) {
    static const double axis[3] = {0.6, 0, 0.8}, to[3] = {0.4, -0.2, 1.5};
    double g_p[6 * GN] = {0}, x[3 * GV], y[3], c, loss = 0, angle;
    web    w;
    int    i, j, k;
    for (angle = 0.001; angle < 7; angle *= 3) {
        web_open(&w, 0, 6);
        for (j = 0; j <= w.g->nv; j++) {    /* Rodrigues, by the axis; nodes, then vertices */
            for (i = 0; i < (j ? 1 : GN); i++) {
                const double *from = j ? w.X + 3 * (j - 1) : w.g->g + 3 * i;
                clothi_cross3(axis, from, y);
                c = clothi_dot3(axis, from);
                for (k = 0; k < 3; k++)
                    y[k] = cos(angle) * from[k] + sin(angle) * y[k] +
                           (1 - cos(angle)) * c * axis[k] + to[k];
                for (k = 0; k < 3 && !j; k++)
                    w.p[6 * i + k] = angle * axis[k], w.p[6 * i + 3 + k] = y[k] - from[k];
            }
            if (j == 0) CHECK(cloth_graph_deform(NULL, w.g, w.X, w.p, x) == CLOTH_OK);
            for (k = 0; k < 3 && j; k++) CHECK_NEAR(x[3 * (j - 1) + k], y[k], 1e-14);
        }
        CHECK(cloth_graph_rigidity(NULL, w.g, w.p, 1, &loss, g_p) == CLOTH_OK && loss < 1e-28);
        web_close(&w);
    }
}

/* Nodes and who is bound to them as the section says, by brute force. */
static void graph_bindings(void) {
    double sum[GV] = {0}, most, d;
    int    many[GV] = {0}, i, j, k, v, n = 0;
    web    w;
    web_open(&w, 0, 7);
    for (j = 0; j < GN; j++) {              /* each node is as far from those before as can be */
        double far = 0, own = HUGE_VAL;
        for (v = 0; v < w.g->nv; v++) {
            for (k = 0, most = HUGE_VAL; k < j; k++) {
                double e[3];
                clothi_sub3(w.X + 3 * v, w.g->g + 3 * k, e);
                most = fmin(most, sqrt(clothi_dot3(e, e)));
            }
            if (j && most > far) far = most;
            if (memcmp(w.X + 3 * v, w.g->g + 3 * j, 3 * sizeof(double)) == 0) own = most;
        }
        CHECK(j ? !(fabs(own - far) > 0)
                : memcmp(w.g->g, w.X + 9, 3 * sizeof(double)) == 0);
        for (i = w.g->start[j]; i < w.g->start[j + 1]; i++) {
            double all[GN], e[3];
            v = w.g->vertex[i];
            CHECK(i == w.g->start[j] || v > w.g->vertex[i - 1]);
            for (k = 0; k < GN; k++) {
                clothi_sub3(w.X + 3 * v, w.g->g + 3 * k, e);
                all[k] = sqrt(clothi_dot3(e, e));
            }
            d = all[j];
            for (k = 0, n = 0; k < GN; k++) n += all[k] < d;
            CHECK(n < GK);
            for (n = 0; n <= GK; n++) {     /* the (k + 1)-th smallest */
                int at = 0;
                for (k = 0; k < GN; k++) at = all[k] < all[at] ? k : at;
                most = all[at];
                all[at] = HUGE_VAL;
            }
            sum[v] += w.g->weight[i];
            many[v]++;
            CHECK(w.g->weight[i] >= 0 && d <= most);
        }
    }
    for (v = 0; v < w.g->nv; v++) {
        CHECK(many[v] == GK);
        CHECK_NEAR(sum[v], 1, 1e-15);
    }
    web_close(&w);
}

/* Neighbours share a vertex. */
static void graph_neighbours(void) {
    int near[GN][GN], j, k, v, n;
    web w;
    web_open(&w, 0, 7);
    memset(near, 0, sizeof near);
    for (v = 0; v < w.g->nv; v++)
        for (j = 0; j < GN; j++)
            for (k = 0; k < GN; k++) {
                int a, b;
                for (a = w.g->start[j]; a < w.g->start[j + 1] && w.g->vertex[a] != v; a++) continue;
                for (b = w.g->start[k]; b < w.g->start[k + 1] && w.g->vertex[b] != v; b++) continue;
                near[j][k] |= j < k && a < w.g->start[j + 1] && b < w.g->start[k + 1];
            }
    for (j = 0, n = 0; j < GN; j++)
        for (k = 0; k < GN; k++) {
            if (!near[j][k]) continue;
            CHECK(n < w.g->nedge && w.g->edge[2 * n] == j && w.g->edge[2 * n + 1] == k);
            n++;
        }
    CHECK(n == w.g->nedge && n >= GN - 1);
    web_close(&w);
}

/* Weights by hand: points on a line, a node at each end and in the middle. */
static void graph_weights(void) {
    static const double X[15] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 4, 0, 0};
    cloth_graph *g = NULL;
    double       a = 1 - 1.0 / 3, b = 1 - 1.0 / 3;
    int          i;
    CHECK(cloth_graph_create(NULL, 5, X, 3, 2, 0, &g) == CLOTH_OK);
    CHECK(!(fabs(g->g[3] - 4) > 0) && !(fabs(g->g[6] - 2) > 0) && g->nedge == 2);
    for (i = g->start[2]; i < g->start[3]; i++)             /* of the middle */
        CHECK_NEAR(g->weight[i], g->vertex[i] == 2 ? 1 : g->vertex[i] % 2 ? a * a / (a * a + b * b)
                                                         : 0.25 / 1.25, 1e-15);
    cloth_graph_destroy(NULL, g);
    CHECK(cloth_graph_create(NULL, 5, X, 2, 2, 0, &g) == CLOTH_OK && g->nedge == 1);
    for (i = 0; i < g->start[1]; i++)       /* all nodes: to twice the farther one */
        if (g->vertex[i] == 1) {
            a = 1 - 1.0 / 6, b = 1 - 3.0 / 6;
            CHECK_NEAR(g->weight[i], a * a / (a * a + b * b), 1e-15);
        }
    cloth_graph_destroy(NULL, g);
    CHECK(cloth_graph_create(NULL, 5, X, 5, 1, 2, &g) == CLOTH_OK && g->nedge == 0);
    for (i = 0; i < 5; i++) CHECK(!(fabs(g->weight[i] - 1) > 0));
    cloth_graph_destroy(NULL, g);
}

static void graph_refused(void) {
    static const int bad[7][4] = {{0, 1, 1, 0}, {5, 6, 1, 0}, {5, 3, 4, 0}, {5, 3, 0, 0},
                                  {5, 3, 2, 5}, {5, 3, 2, -1}, {-2, 1, 1, 0}};
    double       X[3 * 40], x[3 * GV], g[6 * GN], loss = 4;
    cloth_graph *made;
    web          w;
    int          i, n;
    hooks = host_hooks(&told);
    fill(X, 120, 1, 8);
    for (i = 0; i < 7; i++) {
        made = (cloth_graph *)(void *)X;
        CHECK(cloth_graph_create(&hooks, bad[i][0], X, bad[i][1], bad[i][2], bad[i][3], &made) ==
              CLOTH_ERR_ARGUMENT && !made && told.errors == i + 1);
    }
    memcpy(X + 3, X, 3 * sizeof *X);        /* four places, five nodes */
    CHECK(cloth_graph_create(&hooks, 5, X, 5, 2, 0, &made) == CLOTH_ERR_ARGUMENT && !made);
    CHECK(strstr(told.text, "4 places") && told.live == 0);
    CHECK(cloth_graph_create(&hooks, 5, NULL, 3, 2, 0, &made) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_graph_create(&hooks, 5, X, 3, 2, 0, NULL) == CLOTH_ERR_ARGUMENT);
    X[9] = HOST_NAN;
    CHECK(cloth_graph_create(&hooks, 5, X, 3, 2, 0, &made) == CLOTH_ERR_NONFINITE && !made);
    X[9] = 0;
    for (n = 1; n < 20; n++) {
        told.fail_at = told.calls + n;
        if (cloth_graph_create(&hooks, 40, X, 6, 3, 0, &made) == CLOTH_OK) break;
        CHECK(!made && told.live == 0);
    }
    CHECK(n == 7);
    told.fail_at = 0;
    cloth_graph_destroy(&hooks, made);
    cloth_graph_destroy(&hooks, NULL);
    CHECK(told.live == 0);
    web_open(&w, 1, 9);
    g[0] = w.p[6], w.p[6] = 1e160;          /* its square is no number */
    CHECK(cloth_graph_deform(&hooks, w.g, w.X, w.p, x) == CLOTH_ERR_NONFINITE);
    CHECK(strstr(told.text, "r of node 1") != NULL);
    w.p[6] = g[0];
    CHECK(cloth_graph_deform(&hooks, NULL, w.X, w.p, x) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_graph_deform(&hooks, w.g, w.X, w.p, w.X) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_graph_vjp(&hooks, w.g, w.X, w.p, NULL, g, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_graph_rigidity(&hooks, w.g, w.p, -1, &loss, NULL) == CLOTH_ERR_ARGUMENT);
    w.p[6 * GN - 1] = HOST_NAN;
    CHECK(cloth_graph_deform(&hooks, w.g, w.X, w.p, x) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_graph_rigidity(&hooks, w.g, w.p, 1, &loss, NULL) == CLOTH_ERR_NONFINITE);
    CHECK(!(fabs(loss - 4) > 0));
    w.p[6 * GN - 1] = 0;
    for (i = 0; i < 2; i++) {               /* weights, which may be written */
        w.g->weight[3] = i ? HOST_INFINITY : HOST_NAN;
        memset(g, 0, sizeof g);
        CHECK(cloth_graph_deform(&hooks, w.g, w.X, w.p, x) == CLOTH_ERR_NONFINITE);
        CHECK(strstr(told.text, "weight[3]") != NULL);
        CHECK(cloth_graph_vjp(&hooks, w.g, w.X, w.p, w.X, g, NULL) == CLOTH_ERR_NONFINITE);
        for (n = 0; n < 6 * GN; n++) CHECK(!(fabs(g[n]) > 0));
    }
    web_close(&w);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(targets);
    RUN(targets_masked);
    RUN(targets_refused);
    RUN(targets_on_a_tape);
    RUN(nearest_triangle);
    RUN(nearest_flat);
    RUN(nearest_huge);
    RUN(nearest_mesh);
    RUN(nearest_derivative);
    RUN(layer_differences);
    RUN(layer_attached);
    RUN(layer_strides);
    RUN(layer_own_frames);
    RUN(layer_apart);
    RUN(layer_failures);
    RUN(layer_reports);
    RUN(layer_far);
    RUN(layer_no_step);
    RUN(layer_contact);
    RUN(layer_intersecting);
    RUN(layer_refused);
    RUN(layer_meddled);
    RUN(layer_without_body);
    RUN(layer_paused);
    RUN(layer_memory);
    RUN(graph_derivatives);
    RUN(graph_at_rest);
    RUN(graph_rigid);
    RUN(graph_bindings);
    RUN(graph_neighbours);
    RUN(graph_weights);
    RUN(graph_refused);
    return TEST_END();
}
