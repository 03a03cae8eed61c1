/* test_grid.c - the distance grid: closed forms and their order, brute force in long double on a
 * scanned body, overlaps, what lies outside the box, refusals, workers.   tier: default
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_grid.c -o test_grid -lm && ./test_grid */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include <float.h>
#include "test.h"
#include "host.h"
#include "body.h"
#include "shapes.h"

static unsigned long long seed = 1;

static double uniform(double a, double b) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return a + (b - a) * (double)(seed >> 11) / 9007199254740992.0;
}

static cloth_grid_desc desc_of(const shape *s, double cell) {
    cloth_grid_desc d = cloth_grid_desc_default();
    d.nv = s->nv;
    d.x = s->x;
    d.nf = s->nf;
    d.faces = s->faces;
    d.cell = cell;
    return d;
}

static cloth_grid *make(const shape *s, double cell, double band) {
    cloth_grid_desc d = desc_of(s, cell);
    cloth_grid     *g = NULL;
    d.band = band;
    CHECK(cloth_grid_create(&d, &g) == CLOTH_OK);
    if (!g) exit(2);
    return g;
}

static void node_at(const cloth_grid *g, size_t node, double *p) {
    const size_t nx = (size_t)g->n[0], ny = (size_t)g->n[1];
    p[0] = g->origin[0] + g->cell * (double)(node % nx);
    p[1] = g->origin[1] + g->cell * (double)(node / nx % ny);
    p[2] = g->origin[2] + g->cell * (double)(node / nx / ny);
}

static size_t nodes_of(const cloth_grid *g) {
    return (size_t)g->n[0] * (size_t)g->n[1] * (size_t)g->n[2];
}

/* --- references --- */

/* Distance from the mesh in long double: the nearest of vertices, feet on edges, feet on planes
 * that are inside by barycentric coordinates. */
static long double segment(const long double *p, const long double *a, const long double *b) {
    long double e2 = 0, t = 0, d2 = 0;
    int         i;
    for (i = 0; i < 3; i++) {
        e2 += (b[i] - a[i]) * (b[i] - a[i]);
        t += (p[i] - a[i]) * (b[i] - a[i]);
    }
    t = e2 > 0 ? fminl(1, fmaxl(0, t / e2)) : 0;
    for (i = 0; i < 3; i++) d2 += powl(p[i] - a[i] - t * (b[i] - a[i]), 2);
    return d2;
}

static long double brute(const double *x, int nf, const int *faces, const double *at) {
    long double best = 1e300L, p[3];
    int         f, i, k;
    for (i = 0; i < 3; i++) p[i] = (long double)at[i];
    for (f = 0; f < nf; f++) {
        long double c[3][3], g[2][2], r[2], det, s, t, box = 0;
        for (i = 0; i < 3; i++) {
            const double *q = x + i;
            const int    *v = faces + 3 * f;
            const double  lo = fmin(q[3 * v[0]], fmin(q[3 * v[1]], q[3 * v[2]]));
            const double  hi = fmax(q[3 * v[0]], fmax(q[3 * v[1]], q[3 * v[2]]));
            const double  d = fmax(0, fmax(lo - at[i], at[i] - hi));
            box += (long double)d * (long double)d;
        }
        if (box > best) continue;
        for (k = 0; k < 3; k++)
            for (i = 0; i < 3; i++) c[k][i] = (long double)x[3 * faces[3 * f + k] + i];
        best = fminl(best, segment(p, c[0], c[1]));
        best = fminl(best, segment(p, c[1], c[2]));
        best = fminl(best, segment(p, c[2], c[0]));
        memset(g, 0, sizeof g);
        r[0] = r[1] = 0;
        for (i = 0; i < 3; i++) {
            const long double u = c[1][i] - c[0][i], v = c[2][i] - c[0][i], w = p[i] - c[0][i];
            g[0][0] += u * u;
            g[0][1] += u * v;
            g[1][1] += v * v;
            r[0] += u * w;
            r[1] += v * w;
        }
        det = g[0][0] * g[1][1] - g[0][1] * g[0][1];
        if (!(det > 0)) continue;
        s = (r[0] * g[1][1] - r[1] * g[0][1]) / det;
        t = (r[1] * g[0][0] - r[0] * g[0][1]) / det;
        if (s < 0 || t < 0 || s + t > 1) continue;
        for (det = 0, i = 0; i < 3; i++)
            det += powl(p[i] - c[0][i] - s * (c[1][i] - c[0][i]) - t * (c[2][i] - c[0][i]), 2);
        best = fminl(best, det);
    }
    return sqrtl(best);
}

/* --- closed forms --- */

typedef double distance_fn(const double *p);

static double sphere_distance(const double *p) {
    return sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 1;
}

static double torus_distance(const double *p) {
    const double r = sqrt(p[0] * p[0] + p[1] * p[1]) - 1;
    return sqrt(r * r + p[2] * p[2]) - 0.4;
}

static double box_distance(const double *p) {
    const double half[3] = {0.5, 0.4, 0.3};
    double       out = 0, in = -1e300;
    int          a;
    for (a = 0; a < 3; a++) {
        const double d = fabs(p[a]) - half[a];
        if (d > 0) out += d * d;
        in = fmax(in, d);
    }
    return in > 0 ? sqrt(out) : in;
}

/* Largest errors of distance and gradient at random points with |d| < reach; what is smooth. */
static void errors(const cloth_grid *g, distance_fn *fn, double reach, double *e, double *slope) {
    int i, a, n = 0;
    *e = *slope = 0;
    while (n < 4000) {
        double p[3], d, grad[3], exact, h = 1e-6;
        for (a = 0; a < 3; a++)
            p[a] = uniform(g->origin[a], g->origin[a] + g->cell * (g->n[a] - 1));
        exact = fn(p);
        if (fabs(exact) > reach) continue;
        n++;
        CHECK(cloth_grid_sample(g, p, &d, grad) == CLOTH_OK);
        *e = fmax(*e, fabs(d - exact));
        for (i = 0; i < 3; i++) {
            double q[3], up;
            memcpy(q, p, sizeof q);
            q[i] = p[i] + h;
            up = fn(q);
            q[i] = p[i] - h;
            *slope = fmax(*slope, fabs(grad[i] - (up - fn(q)) / (2 * h)));
        }
    }
}

static void order_of(const char *name, const shape *s, distance_fn *fn, double reach) {
    const int n = test_full() ? 3 : 2;      /* the finest takes most of the time */
    double    e[3], slope[3], cell = 0.1;
    int       i;
    for (i = 0; i < n; i++, cell /= 2) {
        cloth_grid *g = make(s, cell, reach + 2 * cell);
        errors(g, fn, reach, &e[i], &slope[i]);
        printf("    %s cell %.3f: error %.2e, of the gradient %.2e\n", name, cell, e[i], slope[i]);
        cloth_grid_destroy(g);
    }
    /* the mesh itself is 1e-4 off at the finest */
    CHECK(e[0] / e[1] > 3.4 && e[0] / e[1] < 4.6 && slope[0] / slope[1] > 1.7);
    if (n > 2) CHECK(e[1] / e[2] > 2.8 && e[1] / e[2] < 4.6 && slope[1] / slope[2] > 1.6);
}

static void sphere(void) {
    const double o[3] = {0, 0, 0};
    shape        s = {0, 0, NULL, NULL};
    shape_sphere(&s, o, 1, 180);
    order_of("sphere", &s, sphere_distance, 0.1);
    shape_free(&s);
}

static void torus(void) {
    shape s = {0, 0, NULL, NULL};
    shape_torus(&s, 1, 0.4, 320, 140);
    order_of("torus ", &s, torus_distance, 0.1);
    shape_free(&s);
}

/* Flat faces: nodes are exact. Inside a cell the interpolant of a distance to one plane is too. */
static void box(void) {
    const double lo[3] = {-0.5, -0.4, -0.3}, hi[3] = {0.5, 0.4, 0.3};
    shape        s = {0, 0, NULL, NULL};
    cloth_grid  *g;
    double       worst = 0, p[3], d, grad[3];
    size_t       i;
    shape_box(&s, lo, hi);
    g = make(&s, 0.047, 0.25);
    for (i = 0; i < nodes_of(g); i++) {
        node_at(g, i, p);
        worst = fmax(worst, fabs(g->phi[i] - fmax(-0.25, fmin(0.25, box_distance(p)))));
    }
    CHECK(worst < 1e-15);
    p[0] = 0.013, p[1] = 0.021, p[2] = 0.31;
    CHECK(cloth_grid_sample(g, p, &d, grad) == CLOTH_OK);
    CHECK_NEAR(d, 0.01, 1e-15);
    CHECK_NEAR(grad[2], 1, 1e-13);
    CHECK_NEAR(fabs(grad[0]) + fabs(grad[1]), 0, 1e-13);
    cloth_grid_destroy(g);
    shape_free(&s);
}

/* Nodes 1e-6 outside, and 1e-6 inside, all faces, edges and corners of a box. */
static void off_by_a_micron(void) {
    int side;
    for (side = -1; side <= 1; side += 2) {
        const double half = 0.5 + 1e-6 * side;
        const double lo[3] = {-half, -half, -half}, hi[3] = {half, half, half};
        shape        s = {0, 0, NULL, NULL};
        cloth_grid_desc d;
        cloth_grid  *g;
        size_t       i;
        int          wrong = 0, on = 0;
        shape_box(&s, lo, hi);
        d = desc_of(&s, 0.125);                 /* 13 nodes an axis, at multiples of the cell */
        d.margin = 1.25 - half - 1e-7 - 0.5;
        CHECK(cloth_grid_create(&d, &g) == CLOTH_OK);
        if (!g) exit(2);
        for (i = 0; i < nodes_of(g); i++) {
            double p[3], far;
            node_at(g, i, p);
            far = fmax(fabs(p[0]), fmax(fabs(p[1]), fabs(p[2])));
            on += fabs(far - 0.5) < 1e-9;
            wrong += (g->phi[i] < 0) != (far < half);
        }
        CHECK(wrong == 0 && on == 9 * 9 * 9 - 7 * 7 * 7);
        cloth_grid_destroy(g);
        shape_free(&s);
    }
}

/* Octahedra with corners on nodes: of a node on a face rounding may hold the face for nearer than
 * the box around it. */
static void corners_on_nodes(void) {
    static const int face[8][3] = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                   {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    double           worst = 0;
    int              n, i, k;
    for (n = 0; n < 1000; n++) {
        const double cell = uniform(0.01, 1), corner = uniform(0, 3);
        double       at[3];
        shape        s = {0, 0, NULL, NULL};
        cloth_grid  *g;
        size_t       node;
        for (k = 0; k < 3; k++) at[k] = floor(uniform(-20, 21)) * cell;
        shape_room(&s, 6, 8);
        for (i = 0; i < 6; i++) {
            const double half = (i & 1 ? -1 : 1) * floor(uniform(1, 5)) * cell;
            shape_vertex(&s, at[0] + (i / 2 == 0) * half, at[1] + (i / 2 == 1) * half,
                         at[2] + (i / 2 == 2) * half);
        }
        for (i = 0; i < 8; i++) {           /* from any corner on */
            const int *f = face[i];
            k = (int)corner;
            shape_face(&s, f[k], f[(k + 1) % 3], f[(k + 2) % 3]);
        }
        g = make(&s, cell, 0);
        for (node = 0; node < nodes_of(g); node++) {
            double p[3], b[3], d2 = g->band * g->band;
            node_at(g, node, p);
            for (i = 0; i < 8; i++)
                d2 = fmin(d2, clothi_face_distance2(s.x, s.faces + 3 * i, p, b));
            worst = fmax(worst, fabs(fabs(g->phi[node]) - sqrt(d2)) / g->band);
        }
        cloth_grid_destroy(g);
        shape_free(&s);
    }
    CHECK(worst < 1e-9);
}

/* --- overlaps --- */

static void overlapping_spheres(void) {
    const double at[2][3] = {{-0.6, 0, 0}, {0.6, 0, 0}}, deep[3] = {0, 0, 0};
    const double half[3] = {-0.6, 0, 0}, third[3] = {1.1, 0, 0};
    shape        s = {0, 0, NULL, NULL};
    cloth_grid  *g;
    double       d, worst = 0;
    size_t       i;
    int          wrong = 0, a;
    shape_sphere(&s, at[0], 1, 48);
    shape_sphere(&s, at[1], 1, 48);
    shape_sphere(&s, third, 0.3, 20);           /* wholly inside */
    g = make(&s, test_full() ? 0.05 : 0.07, 1);
    for (i = 0; i < nodes_of(g); i++) {
        double p[3], r[2], near_by;
        node_at(g, i, p);
        for (a = 0; a < 2; a++)
            r[a] = sqrt((p[0] - at[a][0]) * (p[0] - at[a][0]) + p[1] * p[1] + p[2] * p[2]) - 1;
        near_by = fmin(r[0], r[1]);
        if (fabs(near_by) > 0.003) wrong += (g->phi[i] < 0) != (near_by < 0);
        if (near_by > 0) worst = fmax(worst, fabs(g->phi[i] - fmin(1, near_by)));
    }
    CHECK(wrong == 0);
    CHECK(worst < 0.003);
    /* the boundary of the union is 0.8 from the middle of the lens, its hidden walls 0.4; the cut
       faces, which reach 0.08 inside, count */
    CHECK(cloth_grid_sample(g, deep, &d, NULL) == CLOTH_OK);
    CHECK(d < -0.72 && d > -0.803);
    CHECK(cloth_grid_sample(g, half, &d, NULL) == CLOTH_OK);
    CHECK(d < -0.93);                           /* the kink at the centre is rounded off */
    cloth_grid_destroy(g);
    shape_free(&s);
}

/* Distance of p from an axis-aligned box, m; inside -1. */
static double box_far(const double *p, const double *lo, const double *hi) {
    double far2 = 0;
    int    k, inside = 1;
    for (k = 0; k < 3; k++) {
        const double d = fmax(0, fmax(lo[k] - p[k], p[k] - hi[k]));
        far2 += d * d;
        inside &= p[k] > lo[k] && p[k] < hi[k];
    }
    return inside ? -1 : sqrt(far2);
}

/* Boxes with corners on a lattice, to rounding in every other mesh, which overlap, stand flush on
 * each other and touch: a face that another part covers in part counts whole. */
static void flush_boxes(void) {
    double worst = 0;
    int    n, i, k, wrong = 0;
    for (n = 0; n < 80; n++) {
        const int   boxes = 2 + n % 3;
        double      lo[4][3], hi[4][3];
        shape       s = {0, 0, NULL, NULL};
        cloth_grid *g;
        size_t      node;
        for (i = 0; i < boxes; i++) {
            for (k = 0; k < 3; k++) {
                const double a = floor(uniform(0, 6)), b = floor(uniform(1, 5));
                lo[i][k] = a / 3;
                hi[i][k] = n & 1 ? a / 3 + b / 3 : (a + b) / 3;
            }
            shape_box(&s, lo[i], hi[i]);
        }
        g = make(&s, uniform(0.13, 0.18), 0);
        for (node = 0; node < nodes_of(g); node++) {
            double p[3], far = g->band;
            node_at(g, node, p);
            for (i = 0; i < boxes; i++) far = fmin(far, box_far(p, lo[i], hi[i]));
            if (fabs(far) > 1e-9 && fabs(g->phi[node]) > 1e-9)
                wrong += (g->phi[node] < 0) != (far < 0);
            if (far > 1e-9) worst = fmax(worst, fabs(g->phi[node] - far));
        }
        cloth_grid_destroy(g);
        shape_free(&s);
    }
    CHECK(wrong == 0);
    CHECK(worst < 1e-9);
}

/* A box turned inside out, beside another, has no inside and no boundary. */
static void inverted_box(void) {
    const double lo[3] = {-1, -1, -1}, hi[3] = {1, 1, 1};
    const double beside[2][3] = {{1.3, 1.3, 1.3}, {1.7, 1.7, 1.7}};
    shape        s = {0, 0, NULL, NULL};
    cloth_grid  *g;
    double       worst = 0;
    size_t       node;
    int          i;
    shape_box(&s, lo, hi);
    shape_box(&s, beside[0], beside[1]);
    for (i = 12; i < 24; i++) {
        const int f = s.faces[3 * i];
        s.faces[3 * i] = s.faces[3 * i + 1], s.faces[3 * i + 1] = f;
    }
    g = make(&s, 0.1, 1);
    for (node = 0; node < nodes_of(g); node++) {
        double p[3], far;
        node_at(g, node, p);
        far = box_far(p, lo, hi);
        if (far > 0) worst = fmax(worst, fabs(g->phi[node] - fmin(far, g->band)));
    }
    CHECK(worst < 1e-9);
    cloth_grid_destroy(g);
    shape_free(&s);
}

/* --- a body --- */

typedef struct tally {
    int    n, wrong, twice;
    double outer, inner;    /* largest error outside; largest |phi| too small inside */
} tally;

static void check_node(const cloth_grid *g, const shape *s, size_t node, tally *t) {
    double      p[3], off;
    long double w, d;
    node_at(g, node, p);
    w = shape_winding(s->x, s->nf, s->faces, p, -1);
    d = brute(s->x, s->nf, s->faces, p);
    off = fabs(g->phi[node]) - (double)fminl((long double)g->band, d);
    t->n++;
    t->wrong += (g->phi[node] < 0) != (w > 0.5L);
    t->twice += w > 1.5L;
    if (w < 0.5L) t->outer = fmax(t->outer, fabs(off));
    else t->inner = fmax(t->inner, -off);       /* covered faces are not counted in phi */
}

static size_t node_near(const cloth_grid *g, const double *p) {
    size_t at = 0;
    int    a;
    for (a = 2; a >= 0; a--)
        at = at * (size_t)g->n[a] + (size_t)((p[a] - g->origin[a]) / g->cell + 0.5);
    return at;
}

/* [nf] 1 for faces inside of another part; the caller's to free. */
static unsigned char *covered_faces(const shape *s) {
    unsigned char *covered = (unsigned char *)malloc((size_t)s->nf);
    clothi_surface u;
    clothi_bvh     tree;
    if (!covered) exit(2);
    memset(&u, 0, sizeof u);
    CHECK(clothi_bvh_faces(NULL, s->nv, s->x, s->nf, s->faces, &tree) == CLOTH_OK);
    u.x = s->x, u.faces = s->faces, u.tree = &tree;
    CHECK(clothi_surface_covered(NULL, &u, s->nf, covered) == CLOTH_OK);
    clothi_bvh_free(NULL, &tree);
    return covered;
}

/* Signs and distances at nodes everywhere, in the band, and by faces that are inside. */
static void check_body(const double *x, const cloth_mesh *m, double cell, int samples) {
    shape          s;
    cloth_grid    *g;
    tally          all;
    size_t         i, stride;
    unsigned char *covered;
    int            pass, f, inside = 0, met = 0;
    clock_t        t;
    s.nv = m->nv, s.nf = m->nf, s.faces = m->faces;
    s.x = (double *)malloc(3 * (size_t)m->nv * sizeof(double));
    if (!s.x) exit(2);
    memcpy(s.x, x, 3 * (size_t)m->nv * sizeof(double));
    memset(&all, 0, sizeof all);
    t = clock();
    g = make(&s, cell, 0);
    t = clock() - t;
    for (i = 0; i < nodes_of(g); i++) inside += g->phi[i] < 0;
    stride = nodes_of(g) / (size_t)samples + 1;
    for (pass = 0; pass < 2; pass++)
        for (i = (size_t)(uniform(0, (double)stride)); i < nodes_of(g); i += stride) {
            size_t at = i;
            while (pass && at < nodes_of(g) - 1 && fabs(g->phi[at]) >= g->band) at++;
            check_node(g, &s, at, &all);
        }
    covered = covered_faces(&s);
    for (f = 0; f < s.nf; f++)
        if (covered[f] && met++ % 20 == 0)
            check_node(g, &s, node_near(g, s.x + 3 * s.faces[3 * f]), &all);
    free(covered);
    printf("    %d x %d x %d nodes, %.1f MB, %.2f s; of %d nodes %d inside twice; volume %.5f; "
           "error %.1e\n", g->n[0], g->n[1], g->n[2], (double)cloth_grid_bytes(g) / 1e6,
           (double)t / CLOCKS_PER_SEC, all.n, all.twice, inside * cell * cell * cell, all.outer);
    CHECK(all.wrong == 0);
    CHECK(all.outer < 1e-14 && all.inner < 1e-14);
    CHECK(met < 100 || all.twice > 3);
    CHECK_NEAR(inside * cell * cell * cell, 0.0488, 0.002);
    cloth_grid_destroy(g);
    free(s.x);
}

static void walking_body(void) {
    const int frames[3] = {0, 174, 288}, samples = test_full() ? 3000 : 40;
    body      b;
    double   *x;
    int       i;
    if (!body_load(&b)) SKIP("no body beside the checkout");
    x = (double *)malloc(3 * (size_t)b.mesh->nv * sizeof *x);
    for (i = 0; i < 3; i++) {
        body_pose(&b, frames[i], x);
        check_body(x, b.mesh, i == 0 && test_full() ? 0.01 : 0.02, samples);
    }
    free(x);
    body_free(&b);
}

/* --- sampling --- */

/* By hand: phi of a trilinear function is reproduced, gradient and all; and saved as arrays. */
static void interpolant(void) {
    double     phi[3 * 4 * 5], p[3], d, grad[3];
    cloth_grid g, bad;
    int        i, j, k, n;
    g.n[0] = 3, g.n[1] = 4, g.n[2] = 5;
    g.origin[0] = -1, g.origin[1] = 0.5, g.origin[2] = 2;
    g.cell = 0.25;
    g.band = 1e3;
    g.phi = phi;
    for (k = 0; k < 5; k++)
        for (j = 0; j < 4; j++)
            for (i = 0; i < 3; i++) phi[(k * 4 + j) * 3 + i] = 2 + i - 3 * j + 5 * k + i * j * k;
    for (n = 0; n < 200; n++) {
        const double u = uniform(0, 2), v = uniform(0, 3), w = uniform(0, 4);
        p[0] = -1 + 0.25 * u, p[1] = 0.5 + 0.25 * v, p[2] = 2 + 0.25 * w;
        CHECK(cloth_grid_sample(&g, p, &d, grad) == CLOTH_OK);
        CHECK_NEAR(d, 2 + u - 3 * v + 5 * w + u * v * w, 1e-12);
        CHECK_NEAR(grad[0], 4 * (1 + v * w), 1e-11);
        CHECK_NEAR(grad[1], 4 * (-3 + u * w), 1e-11);
        CHECK_NEAR(grad[2], 4 * (5 + u * v), 1e-11);
    }
    d = 7;
    p[1] = NAN;
    CHECK(cloth_grid_sample(&g, p, &d, NULL) == CLOTH_ERR_NONFINITE);
    CHECK_NEAR(d, 7, 0);
    CHECK(cloth_grid_sample(NULL, p, &d, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_grid_sample(&g, NULL, &d, NULL) == CLOTH_ERR_ARGUMENT);
    p[1] = 1, bad = g, bad.phi = NULL;
    CHECK(cloth_grid_sample(&bad, p, &d, NULL) == CLOTH_ERR_ARGUMENT);
    bad = g, bad.n[2] = 1;
    CHECK(cloth_grid_sample(&bad, p, &d, NULL) == CLOTH_ERR_ARGUMENT);
    bad = g, bad.cell = 0;
    CHECK(cloth_grid_sample(&bad, p, &d, NULL) == CLOTH_ERR_ARGUMENT);
    bad.cell = NAN;
    CHECK(cloth_grid_sample(&bad, p, &d, NULL) == CLOTH_ERR_ARGUMENT);
    bad = g, bad.origin[0] = -1e308, p[0] = 1e308;
    CHECK(cloth_grid_sample(&bad, p, &d, NULL) == CLOTH_ERR_NONFINITE);
}

/* Outside: continuous, never above the true distance, the gradient of what is returned. */
static void outside(void) {
    const double o[3] = {0, 0, 0};
    shape        s = {0, 0, NULL, NULL};
    cloth_grid  *g;
    cloth_grid_desc wall;
    int          i, a, checked = 0;
    shape_sphere(&s, o, 1, 60);
    wall = desc_of(&s, 0.1);                    /* phi has a slope where the grid ends */
    wall.band = 1;
    wall.margin = 0.3;
    CHECK(cloth_grid_create(&wall, &g) == CLOTH_OK);
    for (i = 0; i < 2000; i++) {
        double p[3], q[3], d, e, grad[3], slope[3];
        int    axis = i % 3, out = 0;
        for (a = 0; a < 3; a++) {
            p[a] = uniform(-3, 3);
            out |= fabs(p[a]) > 1.35;
        }
        CHECK(cloth_grid_sample(g, p, &d, grad) == CLOTH_OK);
        if (sphere_distance(p) > 0)             /* but for the error of interpolation, h^2/4 */
            CHECK(d < sphere_distance(p) + 2.6e-3);
        if (out) {
            for (a = 0; a < 3; a++) {
                memcpy(q, p, sizeof q);
                q[a] = p[a] + 1e-6;
                cloth_grid_sample(g, q, &slope[a], NULL);
                q[a] = p[a] - 1e-6;
                cloth_grid_sample(g, q, &e, NULL);
                slope[a] = (slope[a] - e) / 2e-6;
            }
            e = fabs(slope[0] - grad[0]) + fabs(slope[1] - grad[1]) + fabs(slope[2] - grad[2]);
            checked += e < 1e-6;
            CHECK(e < 1e-6 || e < 0.9);         /* at a border of cells both slopes count */
        } else checked++;
        memcpy(q, p, sizeof q);                 /* across the wall of the box */
        q[axis] = p[axis] = g->origin[axis] + (i & 1 ? g->cell * (g->n[axis] - 1) : 0);
        p[axis] += 1e-9;
        q[axis] -= 1e-9;
        cloth_grid_sample(g, p, &d, NULL);
        cloth_grid_sample(g, q, &e, NULL);
        CHECK(fabs(d - e) < 1e-8);
    }
    CHECK(checked > 1990);
    for (i = 0; i < 3; i++) {
        const double far[3] = {1.7e308, -1.7e308, 1e300};
        double       p[3] = {0, 0, 0}, d, grad[3];
        p[i] = far[i];
        p[(i + 1) % 3] = far[0];
        CHECK(cloth_grid_sample(g, p, &d, grad) == CLOTH_OK && d > 1e299 && d <= DBL_MAX);
        CHECK_NEAR(sqrt(clothi_dot3(grad, grad)), 1, 1e-12);
    }
    cloth_grid_destroy(g);
    shape_free(&s);
}

/* --- refusals --- */

static host refusing;

static void refuse(const cloth_grid_desc *d, cloth_status want, const char *word) {
    cloth_grid *g = (cloth_grid *)&refusing;
    refusing.n = 0;
    refusing.text[0] = '\0';
    CHECK(cloth_grid_create(d, &g) == want);
    CHECK(g == NULL && refusing.live == 0);
    if (word && !CHECK(strstr(refusing.text, word) != NULL))
        printf("    '%s' not in: %s\n", word, refusing.text);
}

static void refusals(void) {
    const double    o[3] = {0, 0, 0};
    shape           s = {0, 0, NULL, NULL};
    cloth_grid_desc good, d;
    cloth_hooks     hooks = host_hooks(&refusing);
    cloth_grid     *g;
    int             i, keep;
    shape_sphere(&s, o, 1, 8);
    good = desc_of(&s, 0.25);
    good.hooks = hooks;
    CHECK(cloth_grid_create(&good, NULL) == CLOTH_ERR_ARGUMENT);
    refuse(NULL, CLOTH_ERR_ARGUMENT, NULL);
    d = good, d.cookie = 0, refuse(&d, CLOTH_ERR_UNINIT, NULL);
    d = good, d.x = NULL, refuse(&d, CLOTH_ERR_ARGUMENT, "x");
    d = good, d.faces = NULL, refuse(&d, CLOTH_ERR_ARGUMENT, "faces");
    d = good, d.nf = 3, refuse(&d, CLOTH_ERR_ARGUMENT, "nf = 3");
    d = good, d.nv = -1, refuse(&d, CLOTH_ERR_ARGUMENT, "nv = -1");
    d = good, d.cell = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "cell = 0");
    d = good, d.cell = -1, refuse(&d, CLOTH_ERR_ARGUMENT, "cell = -1");
    d = good, d.cell = 1e308, refuse(&d, CLOTH_ERR_ARGUMENT, "cell = 1e308 must be");
    d = good, d.cell = NAN, refuse(&d, CLOTH_ERR_NONFINITE, "cell");
    d = good, d.band = INFINITY, refuse(&d, CLOTH_ERR_NONFINITE, "band");
    d = good, d.band = 0.1, refuse(&d, CLOTH_ERR_ARGUMENT, "band = 0.1 must be at least 0.5");
    d = good, d.margin = 0.1, refuse(&d, CLOTH_ERR_ARGUMENT, "margin");
    d = good, d.margin = NAN, refuse(&d, CLOTH_ERR_NONFINITE, "margin");
    d = good, d.max_nodes = 100, refuse(&d, CLOTH_ERR_CAPACITY, "more than 100");
    d = good, d.cell = 1e-5, refuse(&d, CLOTH_ERR_CAPACITY, "nodes");
    d = good, d.cell = 1e-12, refuse(&d, CLOTH_ERR_ARGUMENT, "too large for");
    d = good, d.margin = 1e200, refuse(&d, CLOTH_ERR_CAPACITY, "nodes");
    d = good, d.nf--, refuse(&d, CLOTH_ERR_MESH, "not closed");
    d = good, d.nv--, refuse(&d, CLOTH_ERR_MESH, "faces[");
    s.x[7] = NAN, refuse(&good, CLOTH_ERR_NONFINITE, "x[7]"), s.x[7] = 0.1;
    s.x[7] = 1e200, refuse(&good, CLOTH_ERR_ARGUMENT, "x[7]"), s.x[7] = 0.1;
    keep = s.faces[5], s.faces[5] = s.faces[4];
    refuse(&good, CLOTH_ERR_MESH, "faces[1]"), s.faces[5] = keep;
    for (i = 0; i < s.nf; i++) {
        keep = s.faces[3 * i];
        s.faces[3 * i] = s.faces[3 * i + 1];
        s.faces[3 * i + 1] = keep;
        if (i == 0) refuse(&good, CLOTH_ERR_MESH, "not closed");
    }
    refuse(&good, CLOTH_ERR_MESH, "volume");
    for (i = 0; i < s.nf; i++) {
        keep = s.faces[3 * i];
        s.faces[3 * i] = s.faces[3 * i + 1];
        s.faces[3 * i + 1] = keep;
    }
    for (i = 1; i < 100; i++) {
        cloth_status status;
        refusing.calls = 0;
        refusing.fail_at = i;
        status = cloth_grid_create(&good, &g);
        if (status == CLOTH_OK) break;
        CHECK(status == CLOTH_ERR_MEMORY && g == NULL && refusing.live == 0);
    }
    refusing.fail_at = 0;
    CHECK(i > 5 && i < 100 && refusing.live == 1);
    CHECK(cloth_grid_bytes(g) >= 8 * nodes_of(g) && cloth_grid_bytes(g) <= 8 * nodes_of(g) + 400);
    cloth_grid_destroy(g);
    CHECK(refusing.live == 0);
    cloth_grid_destroy(NULL);
    CHECK(cloth_grid_bytes(NULL) == 0);
    shape_free(&s);
}

/* --- workers --- */

static void run_backwards(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    const int piece = *(const int *)user;
    int       end = count;
    (void)grain;
    while (end > 0) {
        const int begin = end > piece ? end - piece : 0;
        fn(begin, end, 0, ctx);
        end = begin;
    }
}

static void workers(void) {
    const double    at[2][3] = {{-0.6, 0, 0}, {0.6, 0, 0}};
    const int       pieces[3] = {1, 5, 1000};
    shape           s = {0, 0, NULL, NULL};
    cloth_grid     *g, *other;
    cloth_grid_desc d;
    int             i;
    shape_sphere(&s, at[0], 1, 12);
    shape_sphere(&s, at[1], 1, 12);
    shape_turn(&s, 0);
    d = desc_of(&s, 0.1);
    CHECK(cloth_grid_create(&d, &g) == CLOTH_OK);
    for (i = 0; i < 3; i++) {
        int piece = pieces[i];
        d.hooks.parallel.run = run_backwards;
        d.hooks.parallel.user = &piece;
        d.hooks.parallel.max_workers = 1;
        CHECK(cloth_grid_create(&d, &other) == CLOTH_OK);
        CHECK(memcmp(g->phi, other->phi, nodes_of(g) * sizeof(double)) == 0);
        CHECK(memcmp(g->n, other->n, sizeof g->n) == 0);
        cloth_grid_destroy(other);
    }
    cloth_grid_destroy(g);
    shape_free(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(sphere);
    RUN(torus);
    RUN(box);
    RUN(off_by_a_micron);
    RUN(overlapping_spheres);
    RUN(walking_body);
    RUN(interpolant);
    RUN(outside);
    RUN(refusals);
    RUN(workers);
    RUN(corners_on_nodes);
    RUN(flush_boxes);
    RUN(inverted_box);
    return TEST_END();
}
