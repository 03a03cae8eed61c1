/* test_obstacles.c - distances of the built-in shapes, and what they sweep, against closed forms.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. test_obstacles.c -lm
 * tier: quick
 *
 * The distance of a point from each shape has a closed form, convex in the point; that of a
 * triangle is its minimum over two coordinates, found by two nested ternary searches. */
#include "../clothsim_collide.h"

#include "test.h"

#define KINDS 4

static const char *const solid_name[KINDS] = {"sphere", "capsule", "plane", "box"};

typedef struct solid {
    cloth_obstacle_kind kind;
    int                 nx;                 /* points of x                                     */
    double              x[24], radius, normal[3];
    double              center[3], half[3], R[9];   /* box                                     */
} solid;

static uint32_t noise = 1;

/* -1 .. 1 */
static double any(void) {
    noise = noise * 1664525u + 1013904223u;
    return (double)(noise >> 8) / 8388608 - 1;
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Sets v to a random direction. */
static void direction(double *v) {
    double len;
    int    k;
    do {
        for (k = 0; k < 3; k++) v[k] = any();
        len = sqrt(dot(v, v));
    } while (len > 1 || len < 0.1);
    for (k = 0; k < 3; k++) v[k] /= len;
}

static solid solid_any(int which) {
    static const cloth_obstacle_kind kind[KINDS] = {CLOTH_OBSTACLE_SPHERE, CLOTH_OBSTACLE_CAPSULE,
                                                    CLOTH_OBSTACLE_PLANE, CLOTH_OBSTACLE_BOX};
    solid  s;
    double q[3], along;
    int    k;
    memset(&s, 0, sizeof s);
    s.kind = kind[which];
    s.nx = which == 1 ? 2 : which == 3 ? 8 : 1;
    for (k = 0; k < 6; k++) s.x[k] = 0.6 * any();
    s.radius = which < 2 ? 0.1 + 0.08 * any() : 0;
    direction(s.normal);
    if (which < 3) return s;
    memcpy(s.center, s.x, sizeof s.center);
    for (k = 0; k < 3; k++) s.half[k] = 0.15 + 0.1 * any();
    do                                      /* the axes: n, q across n, n x q */
        direction(q);
    while (fabs(dot(q, s.normal)) > 0.9);
    for (k = 0; k < 3; k++) s.R[3 * k] = s.normal[k];
    along = dot(q, s.normal);
    for (k = 0; k < 3; k++) q[k] -= along * s.normal[k];
    along = sqrt(dot(q, q));
    for (k = 0; k < 3; k++) s.R[3 * k + 1] = q[k] / along;
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        s.R[3 * k + 2] = s.R[3 * i] * s.R[3 * j + 1] - s.R[3 * j] * s.R[3 * i + 1];
    }
    cloth_obstacle_box(s.center, s.half, s.R, s.x);
    return s;
}

/* Distance of p from the surface, m; outside of it, below 0 in spheres and capsules. */
static double from_point(const solid *s, const double *p) {
    double r[3], e[3], t, sum = 0;
    int    j, k;
    for (k = 0; k < 3; k++) r[k] = p[k] - s->x[k], e[k] = s->x[3 + k] - s->x[k];
    if (s->kind == CLOTH_OBSTACLE_PLANE) return dot(r, s->normal);
    if (s->kind == CLOTH_OBSTACLE_SPHERE) return sqrt(dot(r, r)) - s->radius;
    if (s->kind == CLOTH_OBSTACLE_CAPSULE) {
        t = dot(r, e) / dot(e, e);
        t = t < 0 ? 0 : t > 1 ? 1 : t;
        for (k = 0; k < 3; k++) r[k] -= t * e[k];
        return sqrt(dot(r, r)) - s->radius;
    }
    for (j = 0; j < 3; j++) {
        for (t = 0, k = 0; k < 3; k++) t += s->R[3 * k + j] * (p[k] - s->center[k]);
        t = fmax(fabs(t) - s->half[j], 0);
        sum += t * t;
    }
    return sqrt(sum);
}

/* At u along the first side, the best of the points beyond it. */
static double from_line(const solid *s, const double *tri, double u) {
    double low = 0, high = 1 - u, f[2] = {0, 0}, p[3];
    int    it, i, k;
    for (it = 0; it < 90; it++) {
        double v[2];
        v[0] = low + (high - low) / 3, v[1] = high - (high - low) / 3;
        for (i = 0; i < 2; i++) {
            for (k = 0; k < 3; k++)
                p[k] = tri[k] + u * (tri[3 + k] - tri[k]) + v[i] * (tri[6 + k] - tri[k]);
            f[i] = from_point(s, p);
        }
        if (f[0] < f[1]) high = v[1];
        else low = v[0];
    }
    return fmin(f[0], f[1]);
}

static double from_triangle(const solid *s, const double *tri) {
    double low = 0, high = 1, f = 0, g = 0;
    int    it;
    for (it = 0; it < 90; it++) {
        const double u = low + (high - low) / 3, v = high - (high - low) / 3;
        f = from_line(s, tri, u), g = from_line(s, tri, v);
        if (f < g) high = v;
        else low = u;
    }
    return fmin(f, g);
}

typedef struct scene {
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
} scene;

/* One triangle without gravity. */
static int scene_start(scene *q, const double *tri) {
    static const int   face[3] = {0, 1, 2};
    cloth_desc         d = cloth_desc_default();
    cloth_collide_desc k = cloth_collide_desc_default();
    memset(q, 0, sizeof *q);
    d.nv = 3, d.x_rest = tri;
    d.nf = 1, d.faces = face;
    d.gravity[1] = 0;
    d.contact = CLOTH_CONTACT_OBSTACLES;
    return CHECK(cloth_model_create(&d, &q->model) == CLOTH_OK) &&
           CHECK(cloth_sim_create(q->model, &q->sim) == CLOTH_OK) &&
           CHECK(cloth_collide_create(q->sim, &k, &q->c) == CLOTH_OK);
}

static void scene_end(scene *q) {
    cloth_collide_destroy(q->c);
    cloth_sim_destroy(q->sim);
    cloth_model_destroy(q->model);
}

static cloth_status scene_add(scene *q, const solid *s, cloth_obstacle *id) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    d.kind = s->kind;
    d.x = s->x;
    d.radius = s->radius;
    memcpy(d.normal, s->normal, sizeof d.normal);
    return cloth_collide_add(q->c, &d, id);
}

/* A triangle and a solid that are nearest to farthest m from each other. */
static double apart(int which, double nearest, double farthest, solid *s, double *tri) {
    double d;
    int    k;
    do {
        *s = solid_any(which);
        for (k = 0; k < 9; k++) tri[k] = 0.3 * any();
        d = from_triangle(s, tri);
    } while (d < nearest || d > farthest);
    return d;
}

/* What cloth_collide_gap() says of each shape. */
static void gaps(void) {
    int which, i;
    for (which = 0; which < KINDS; which++) {
        double worst = 0;
        for (i = 0; i < 20; i++) {
            solid          s;
            scene          q;
            cloth_obstacle id;
            double         tri[9], gap = 0, d = apart(which, 1e-3, 0.8, &s, tri);
            if (scene_start(&q, tri) && CHECK(scene_add(&q, &s, &id) == CLOTH_OK)) {
                CHECK(cloth_collide_gap(q.c, 1, &gap) == CLOTH_OK);
                worst = fmax(worst, fabs(gap - d));
            }
            scene_end(&q);
        }
        printf("  %-8s gap off by %.1e m at most\n", solid_name[which], worst);
        CHECK(worst < 1e-9);
    }
}

/* A solid flies 1.5 m along a straight line through a triangle, in one step. */
static void sweeps(void) {
    const double t = cloth_collide_desc_default().thickness;
    int          which, i, j;
    for (which = 0; which < KINDS; which++) {
        double least = INFINITY;
        int    hits = 0;
        for (i = 0; i < 20; i++) {
            solid          s;
            scene          q;
            cloth_obstacle id;
            double         tri[9], to[24], way[3], d = apart(which, 0.01, 0.5, &s, tri);
            for (j = 0; j < 3; j++) {       /* its middle flies to the triangle's, and on */
                double from = 0;
                int    v;
                for (v = 0; v < s.nx; v++) from += s.x[3 * v + j] / s.nx;
                way[j] = (tri[j] + tri[3 + j] + tri[6 + j]) / 3 - from;
            }
            d = sqrt(dot(way, way));
            for (j = 0; j < 3; j++)
                way[j] = s.kind == CLOTH_OBSTACLE_PLANE ? 1.5 * s.normal[j] : 1.5 * way[j] / d;
            for (j = 0; j < 3 * s.nx; j++) to[j] = s.x[j] + way[j % 3];
            if (scene_start(&q, tri) && CHECK(scene_add(&q, &s, &id) == CLOTH_OK)) {
                cloth_collide_report r;
                CHECK(cloth_collide_move(q.c, id, to) == CLOTH_OK);
                CHECK(cloth_step(q.sim, 1.0 / 60, NULL) == CLOTH_OK);
                r = cloth_collide_last(q.c);
                hits += r.impacts > 0;
                memcpy(s.x, to, sizeof to);
                for (j = 0; j < 3; j++) s.center[j] += way[j];
                d = from_triangle(&s, cloth_sim_state(q.sim)->x);
                least = fmin(least, d);
                if (which == 2) CHECK(d < t);   /* nothing else to go to */
            }
            scene_end(&q);
        }
        printf("  %-8s %d of 20 hit, %.3f t away at least when gone\n", solid_name[which], hits,
               least / t);
        CHECK(hits == 20);
        CHECK(least > 0.25 * t - 1e-9);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(gaps);
    RUN(sweeps);
    return TEST_END();
}
