/* shapes.h - a T-shirt with its pattern and a body that walks, made by formula.
 * SPDX-License-Identifier: MIT
 *
 * Helper of the examples, so that everything runs without outside data; libc and libm alone.
 *
 *     shapes_body body;
 *     shapes_shirt shirt;
 *     const char *error = shapes_body_make(0.029, &body);         about 5000 triangles
 *     if (!error) error = shapes_shirt_make(0.02, &shirt);        about 4000 triangles
 *     ...
 *     shapes_body_walk(&body, t, 0.0, x);                         x [body.nv x 3] at time t
 *     shapes_shirt_free(&shirt);
 *     shapes_body_free(&body);
 *
 * Metres, y up, the body 1.7 m tall on the floor y = 0, looking along +z, arms in an A-pose.
 * Faces are counter-clockwise seen from outside.
 *
 * How. Both surfaces are level sets of a smooth union of round cones (capsules of two radii),
 *
 *     d_i(p) = |p - q_i| - r_i     q_i the nearest point of segment i, r_i the radius there
 *     phi(p) = -k log sum_i exp(-d_i(p) / k)                           k in metres
 *
 * phi = 0 swells the plain union by at most k log n where n cones meet. The body is cut out of a
 * grid by surface nets (one vertex in each cell that phi changes sign in, one quad across each
 * edge that it changes sign on), then evened out along the surface. The shirt is made of
 * grid patches on a larger form, evened out by swapping edges and centring vertices within the
 * panels; its pattern is each panel laid flat by relaxing the lengths of its edges in the plane.
 * Measured for edges 0.014 to 0.03 m: pattern lengths within 12 % of those in space (99 % of
 * them within 6 %), gap to the body at least 13 mm, no angle below 25 degrees, nothing crosses.
 *
 *           __/neck\__            front and back: rows from the hem up to the armpit, then on
 *          /  sh     \            between the armholes to the shoulder seams (sh) and the neck;
 *        _/|          |\_         sleeves: from armhole to cuff, their seam under the arm.
 *       \_ |armhole   | _/        Seams join front and back at the sides and the shoulders;
 *         \|          |/          the holes left are neck, hem and two cuffs.
 *          |   hem    |
 */
#ifndef CLOTHSIM_EXAMPLE_SHAPES_H
#define CLOTHSIM_EXAMPLE_SHAPES_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SHAPES_BONES 13

typedef struct shapes_cone {        /* z of both ends is 0 but for head and feet        */
    double a[3], b[3], ra, rb;      /* m                                                */
    int    bone;
} shapes_cone;

typedef struct shapes_form {        /* phi: a list of cones and the width of the blend  */
    const shapes_cone *cone;
    int    n;
    double k;                       /* m                                                */
} shapes_form;

typedef struct shapes_body {
    int     nv, nf;
    double *x;                      /* rest pose       m  [nv x 3]                      */
    int    *faces;                  /*                    [nf x 3]                      */
    int    *bone;                   /* four a vertex      [nv x 4]                      */
    double *weight;                 /* theirs, sum 1      [nv x 4]                      */
} shapes_body;

typedef struct shapes_shirt {
    int     nv, nf, npins;
    double *x;                      /* around the body    m  [nv x 3]                   */
    int    *faces;                  /*                       [nf x 3]                   */
    double *X;                      /* pattern per corner m  [nf x 3 x 2]               */
    int    *panel;                  /* 0 front, 1 back, 2 left sleeve, 3 right  [nf]    */
    int    *pins;                   /* the shoulder seams' vertices             [npins] */
} shapes_shirt;

/* ===== the forms ========================================================================= */

/* the body: torso in two halves of three cones each, shoulders, neck, head, limbs */
static const shapes_cone shapes_body_cones[] = {
    {{-0.060, 0.95, 0}, {-0.055, 1.09, 0}, 0.100, 0.096, 0},
    {{0.000, 0.95, 0}, {0.000, 1.09, 0}, 0.100, 0.096, 0},
    {{0.060, 0.95, 0}, {0.055, 1.09, 0}, 0.100, 0.096, 0},
    {{-0.055, 1.09, 0}, {-0.065, 1.30, 0}, 0.096, 0.096, 1},
    {{0.000, 1.09, 0}, {0.000, 1.32, 0}, 0.096, 0.096, 1},
    {{0.055, 1.09, 0}, {0.065, 1.30, 0}, 0.096, 0.096, 1},
    {{0, 1.415, 0}, {-0.150, 1.385, 0}, 0.050, 0.048, 1},
    {{0, 1.415, 0}, {0.150, 1.385, 0}, 0.050, 0.048, 1},
    {{0, 1.40, 0}, {0, 1.50, 0.01}, 0.050, 0.047, 1},
    {{0, 1.57, 0.015}, {0, 1.63, 0.01}, 0.072, 0.085, 2},
    {{0.165, 1.400, 0}, {0.380, 1.220, 0}, 0.050, 0.040, 3},
    {{-0.165, 1.400, 0}, {-0.380, 1.220, 0}, 0.050, 0.040, 4},
    {{0.380, 1.220, 0}, {0.640, 1.002, 0}, 0.040, 0.035, 5},
    {{-0.380, 1.220, 0}, {-0.640, 1.002, 0}, 0.040, 0.035, 6},
    {{0.090, 0.91, 0}, {0.110, 0.50, 0}, 0.082, 0.054, 7},
    {{-0.090, 0.91, 0}, {-0.110, 0.50, 0}, 0.082, 0.054, 8},
    {{0.110, 0.50, 0}, {0.125, 0.10, -0.01}, 0.052, 0.038, 9},
    {{-0.110, 0.50, 0}, {-0.125, 0.10, -0.01}, 0.052, 0.038, 10},
    {{0.125, 0.055, -0.03}, {0.140, 0.045, 0.13}, 0.042, 0.036, 11},
    {{-0.125, 0.055, -0.03}, {-0.140, 0.045, 0.13}, 0.042, 0.036, 12}};

/* where each bone turns, and the bone that carries it */
static const double shapes_joint[SHAPES_BONES][3] = {
    {0, 0.95, 0}, {0, 1.08, 0}, {0, 1.50, 0}, {0.165, 1.40, 0}, {-0.165, 1.40, 0},
    {0.380, 1.22, 0}, {-0.380, 1.22, 0}, {0.090, 0.91, 0}, {-0.090, 0.91, 0},
    {0.110, 0.50, 0}, {-0.110, 0.50, 0}, {0.125, 0.08, -0.01}, {-0.125, 0.08, -0.01}};
static const int shapes_parent[SHAPES_BONES] = {-1, 0, 1, 1, 1, 3, 4, 0, 0, 7, 8, 9, 10};

/* the shirt's form: the upper body, wider, the same before and behind (symmetric in z) */
static const shapes_cone shapes_shirt_cones[] = {
    {{-0.080, 0.70, 0}, {-0.072, 1.29, 0}, 0.118, 0.110, 0},
    {{0.000, 0.70, 0}, {0.000, 1.31, 0}, 0.118, 0.110, 0},
    {{0.080, 0.70, 0}, {0.072, 1.29, 0}, 0.118, 0.110, 0},
    {{0, 1.420, 0}, {-0.155, 1.395, 0}, 0.050, 0.050, 0},
    {{0, 1.420, 0}, {0.155, 1.395, 0}, 0.050, 0.050, 0},
    {{0, 1.38, 0}, {0, 1.60, 0}, 0.062, 0.062, 0},
    {{0.155, 1.400, 0}, {0.460, 1.145, 0}, 0.060, 0.074, 0},
    {{-0.155, 1.400, 0}, {-0.460, 1.145, 0}, 0.060, 0.074, 0}};

#define SHAPES_COUNT(list) ((int)(sizeof(list) / sizeof *(list)))

/* distance to one cone and the unit direction away from its axis */
static inline double shapes_cone_distance(const shapes_cone *c, const double p[3], double n[3]) {
    double dot = 0, len = 0, l = 0;
    for (int i = 0; i < 3; i++) {
        dot += (p[i] - c->a[i]) * (c->b[i] - c->a[i]);
        len += (c->b[i] - c->a[i]) * (c->b[i] - c->a[i]);
    }
    double w = len > 0 ? dot / len : 0;
    w = w < 0 ? 0 : w > 1 ? 1 : w;
    for (int i = 0; i < 3; i++) {
        n[i] = p[i] - c->a[i] - w * (c->b[i] - c->a[i]);
        l += n[i] * n[i];
    }
    l = sqrt(l);
    for (int i = 0; i < 3; i++) n[i] = l > 1e-12 ? n[i] / l : (i == 2);
    return l - (c->ra + w * (c->rb - c->ra));
}

static inline shapes_form shapes_form_of(const shapes_cone *cone, int n, double k) {
    shapes_form f;
    f.cone = cone;
    f.n = n;
    f.k = k;
    return f;
}

/* the shirt blends more widely, so that the armpit is a curve and not a crease */
static inline shapes_form shapes_body_form(void) {
    return shapes_form_of(shapes_body_cones, SHAPES_COUNT(shapes_body_cones), 0.014);
}
static inline shapes_form shapes_shirt_form(void) {
    return shapes_form_of(shapes_shirt_cones, SHAPES_COUNT(shapes_shirt_cones), 0.032);
}

/* phi and (grad not NULL) its gradient; w [n] takes the cones' shares where not NULL */
static inline double shapes_phi(shapes_form form, const double p[3], double *grad, double *w) {
    double d[32], dir[32][3], least = HUGE_VAL, sum = 0;
    for (int i = 0; i < form.n; i++) {
        d[i] = shapes_cone_distance(&form.cone[i], p, dir[i]);
        least = d[i] < least ? d[i] : least;
    }
    for (int j = 0; grad != NULL && j < 3; j++) grad[j] = 0;
    for (int i = 0; i < form.n; i++) {
        double e = d[i] - least > 40 * form.k ? 0 : exp((least - d[i]) / form.k);
        sum += e;
        if (w != NULL) w[i] = e;
        for (int j = 0; grad != NULL && j < 3; j++) grad[j] += e * dir[i][j];
    }
    for (int j = 0; grad != NULL && j < 3; j++) grad[j] /= sum;
    return least - form.k * log(sum);
}

/* removes from v its parts along the (independent, not always orthogonal) unit normals n */
static inline void shapes_keep(double v[3], const double (*n)[3], int count) {
    double e[3];
    if (count == 0) return;
    double dot = v[0] * n[0][0] + v[1] * n[0][1] + v[2] * n[0][2];
    for (int i = 0; i < 3; i++) v[i] -= dot * n[0][i];
    if (count == 1) return;
    double skew = n[0][0] * n[1][0] + n[0][1] * n[1][1] + n[0][2] * n[1][2], len = 0;
    for (int i = 0; i < 3; i++) {
        e[i] = n[1][i] - skew * n[0][i];
        len += e[i] * e[i];
    }
    dot = (v[0] * e[0] + v[1] * e[1] + v[2] * e[2]) / len;
    for (int i = 0; i < 3; i++) v[i] -= dot * e[i];
}

/* moves p onto phi = 0 along the gradient within the planes that hold it */
static inline void shapes_land(shapes_form form, double p[3], const double (*hold)[3], int holds,
                               int rounds) {
    double g[3];
    for (int r = 0; r < rounds; r++) {
        double f = shapes_phi(form, p, g, NULL);
        shapes_keep(g, hold, holds);
        double len = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
        if (len < 0.02) len = 0.02;
        for (int i = 0; i < 3; i++) p[i] -= f * g[i] / len;
    }
}

/* ===== meshes at work ==================================================================== */

typedef struct shapes_sewing {      /* work in progress                                 */
    int n, ks, kp;                  /* columns: all, of a shoulder, under an armhole    */
    int na, nb, nc;                 /* rows: to the armpit, above it, of a sleeve       */
    int nv, nf, cap;
    double *x;                      /* [cap x 3]                                        */
    double (*hold)[2][3];           /* [cap] unit normals of the planes that hold it    */
    int    *holds;                  /* [cap] their number, 3: fixed                     */
    int    *near;                   /* [cap x 4] neighbours that even it out, -1: none  */
    int    *torso[2];               /* front, back: [(na + nb + 1) x (n + 1)], -1: none */
    int    *sleeve[2];              /* left, right: [(nc + 1) x (2 (kp + nb) + 1)]      */
    int    *faces, *panel;
    int    *spot;                   /* each corner's place in its panel's grid [nf x 3]  */
    int    *twin;                   /* the half-edge on an edge's other side [nf x 3]    */
    int    *head, *link;            /* chains of half-edges by their lower vertex        */
    double *len;                    /* [nf x 3]                                          */
    double *flat;                   /* [cap x 2]                                        */
} shapes_sewing;

static inline double shapes_length(const double *x, int a, int b, int dim) {
    double s = 0;
    for (int c = 0; c < dim; c++) s += (x[dim * a + c] - x[dim * b + c]) *
                                       (x[dim * a + c] - x[dim * b + c]);
    return sqrt(s);
}

static inline int shapes_next(int h) {
    return h % 3 == 2 ? h - 2 : h + 1;
}

/* the half-edge between vertices a and b in the chains, -1: none */
static inline int shapes_find(const shapes_sewing *w, int a, int b) {
    int h = w->head[a < b ? a : b];
    for (; h >= 0; h = w->link[h]) {
        int p = w->faces[h], q = w->faces[shapes_next(h)];
        if ((p == a && q == b) || (p == b && q == a)) return h;
    }
    return -1;
}

/* pairs the half-edges; returns how many edges have more than two */
static inline int shapes_twins(shapes_sewing *w) {
    int bad = 0;
    for (int v = 0; v < w->nv; v++) w->head[v] = -1;
    for (int h = 0; h < 3 * w->nf; h++) {
        int a = w->faces[h], b = w->faces[shapes_next(h)], low = a < b ? a : b;
        int t = shapes_find(w, a, b);
        w->twin[h] = t;
        if (t >= 0) {
            bad += w->twin[t] >= 0;
            w->twin[t] = h;
            continue;
        }
        w->link[h] = w->head[low];
        w->head[low] = h;
    }
    return bad;
}

/* ===== the body ========================================================================== */

static inline void shapes_body_free(shapes_body *b) {
    if (b == NULL) return;
    free(b->x);
    free(b->faces);
    free(b->bone);
    free(b->weight);
    memset(b, 0, sizeof *b);
}

typedef struct shapes_grid {
    int     n[3];                   /* corners in x, y, z                               */
    double  lo[3], h;
    double *phi;                    /* [n0 x n1 x n2], x fastest                        */
    int    *vertex;                 /* of each cell (by its low corner), -1: none       */
} shapes_grid;

static inline size_t shapes_cell(const shapes_grid *g, int i, int j, int k) {
    return (size_t)i + (size_t)g->n[0] * ((size_t)j + (size_t)g->n[1] * (size_t)k);
}

/* one vertex a cell: the mean of the points where phi vanishes on its edges */
static inline void shapes_net_vertex(const shapes_grid *g, const int c[3], shapes_body *b) {
    double sum[3] = {0, 0, 0};
    int hits = 0;
    for (int e = 0; e < 12; e++) {
        int a = e / 4, u = e % 2, w = e / 2 % 2, p[3], q[3];
        p[a] = c[a];
        p[(a + 1) % 3] = c[(a + 1) % 3] + u;
        p[(a + 2) % 3] = c[(a + 2) % 3] + w;
        for (int i = 0; i < 3; i++) q[i] = p[i] + (i == a);
        double fp = g->phi[shapes_cell(g, p[0], p[1], p[2])];
        double fq = g->phi[shapes_cell(g, q[0], q[1], q[2])];
        if ((fp < 0) == (fq < 0)) continue;
        for (int i = 0; i < 3; i++)
            sum[i] += g->lo[i] + g->h * (p[i] + (q[i] - p[i]) * fp / (fp - fq));
        hits++;
    }
    g->vertex[shapes_cell(g, c[0], c[1], c[2])] = hits > 0 ? b->nv : -1;
    if (hits == 0) return;
    if (b->x != NULL) for (int i = 0; i < 3; i++) b->x[3 * b->nv + i] = sum[i] / hits;
    b->nv++;
}

/* the quad across the edge from corner c along axis a, as two triangles */
static inline void shapes_net_quad(const shapes_grid *g, const int c[3], int a, shapes_body *b) {
    int q[4], d[3], inside = g->phi[shapes_cell(g, c[0], c[1], c[2])] < 0;
    static const int step[4][2] = {{1, 1}, {0, 1}, {0, 0}, {1, 0}};
    for (int i = 0; i < 3; i++) d[i] = c[i] + (i == a);
    if (inside == (g->phi[shapes_cell(g, d[0], d[1], d[2])] < 0)) return;
    for (int s = 0; s < 4; s++) {
        int e[3];
        e[a] = c[a];
        e[(a + 1) % 3] = c[(a + 1) % 3] - step[s][0];
        e[(a + 2) % 3] = c[(a + 2) % 3] - step[s][1];
        q[inside ? s : 3 - s] = g->vertex[shapes_cell(g, e[0], e[1], e[2])];
    }
    if (b->faces != NULL) {
        double l[2] = {0, 0};
        for (int k = 0; k < 2; k++) for (int i = 0; i < 3; i++) {
            double v = b->x[3 * q[k] + i] - b->x[3 * q[k + 2] + i];
            l[k] += v * v;
        }
        int *f = b->faces + 3 * b->nf, s = l[0] > l[1];
        f[0] = q[s];
        f[1] = q[s + 1];
        f[2] = q[s + 2];
        f[3] = q[s];
        f[4] = q[s + 2];
        f[5] = q[(s + 3) % 4];
    }
    b->nf += 2;
}

/* visits all cells and edges; counts only while b's arrays are NULL */
static inline void shapes_net(const shapes_grid *g, shapes_body *b) {
    int c[3];
    b->nv = b->nf = 0;
    for (c[2] = 0; c[2] + 1 < g->n[2]; c[2]++)
        for (c[1] = 0; c[1] + 1 < g->n[1]; c[1]++)
            for (c[0] = 0; c[0] + 1 < g->n[0]; c[0]++) shapes_net_vertex(g, c, b);
    for (c[2] = 1; c[2] + 1 < g->n[2]; c[2]++)
        for (c[1] = 1; c[1] + 1 < g->n[1]; c[1]++)
            for (c[0] = 1; c[0] + 1 < g->n[0]; c[0]++)
                for (int a = 0; a < 3; a++) shapes_net_quad(g, c, a, b);
}

/* evens out the vertices along the surface; sum [nv x 4] is scratch */
static inline void shapes_even(shapes_body *b, double *sum) {
    for (int pass = 0; pass < 12; pass++) {
        memset(sum, 0, 4 * (size_t)b->nv * sizeof *sum);
        for (int f = 0; f < 3 * b->nf; f++) {
            int v = b->faces[f], w = b->faces[f % 3 == 2 ? f - 2 : f + 1];
            for (int i = 0; i < 3; i++) sum[4 * v + i] += b->x[3 * w + i];
            sum[4 * v + 3]++;
        }
        for (int v = 0; v < b->nv; v++) {
            double *x = b->x + 3 * v;
            for (int i = 0; i < 3; i++) x[i] += 0.5 * (sum[4 * v + i] / sum[4 * v + 3] - x[i]);
            shapes_land(shapes_body_form(), x, NULL, 0, 3);
        }
    }
}

/* the four bones with the largest shares in phi, scaled to sum 1 */
static inline void shapes_skin(shapes_body *b) {
    int n = SHAPES_COUNT(shapes_body_cones);
    double w[32], bone[SHAPES_BONES];
    for (int v = 0; v < b->nv; v++) {
        double total = 0;
        shapes_phi(shapes_body_form(), b->x + 3 * v, NULL, w);
        memset(bone, 0, sizeof bone);
        for (int i = 0; i < n; i++) bone[shapes_body_cones[i].bone] += w[i];
        for (int k = 0; k < 4; k++) {
            int best = 0;
            for (int i = 1; i < SHAPES_BONES; i++) if (bone[i] > bone[best]) best = i;
            b->bone[4 * v + k] = best;
            b->weight[4 * v + k] = bone[best];
            total += bone[best];
            bone[best] = 0;
        }
        for (int k = 0; k < 4; k++) b->weight[4 * v + k] /= total;
    }
}

/* whether no edge has more than two faces and no triangle is thinner than a fifth of `edge` */
static inline int shapes_sound(const shapes_body *b, double edge, shapes_sewing *w) {
    w->nv = b->nv;
    w->nf = b->nf;
    w->faces = b->faces;
    if (shapes_twins(w) > 0) return 0;
    for (int f = 0; f < b->nf; f++) {
        const int *q = b->faces + 3 * f;
        double l[3], s = 0;
        for (int k = 0; k < 3; k++) {
            l[k] = shapes_length(b->x, q[k], q[(k + 1) % 3], 3);
            s += 0.5 * l[k];
        }
        double area = sqrt(fmax(0, s * (s - l[0]) * (s - l[1]) * (s - l[2])));
        if (2 * area < 0.2 * edge * fmax(l[0], fmax(l[1], l[2]))) return 0;
    }
    return 1;
}

/* one attempt: 1 a sound body, 0 a bad mesh, -1 no memory */
static inline int shapes_body_try(double edge, shapes_body *b) {
    static const double lo[3] = {-0.75, -0.06, -0.20}, hi[3] = {0.75, 1.80, 0.24};
    shapes_grid g;
    shapes_sewing w;
    int result = -1;
    double *sum = NULL;
    memset(&g, 0, sizeof g);
    memset(&w, 0, sizeof w);
    g.h = edge;
    for (int i = 0; i < 3; i++) {
        /* a plane of samples at x = 0 keeps the legs apart and the mesh symmetric */
        g.lo[i] = -edge * ceil(-lo[i] / edge);
        g.n[i] = (int)ceil((hi[i] - g.lo[i]) / edge) + 1;
    }
    size_t cells = shapes_cell(&g, 0, 0, g.n[2]);
    g.phi = (double *)malloc(cells * sizeof *g.phi);
    g.vertex = (int *)malloc(cells * sizeof *g.vertex);
    if (g.phi == NULL || g.vertex == NULL) goto done;
    for (int k = 0; k < g.n[2]; k++) for (int j = 0; j < g.n[1]; j++)
        for (int i = 0; i < g.n[0]; i++) {
            double p[3] = {g.lo[0] + edge * i, g.lo[1] + edge * j, g.lo[2] + edge * k};
            g.phi[shapes_cell(&g, i, j, k)] = shapes_phi(shapes_body_form(), p, NULL, NULL);
        }
    shapes_net(&g, b);
    b->x = (double *)malloc(3 * (size_t)b->nv * sizeof *b->x);
    b->faces = (int *)malloc(3 * (size_t)b->nf * sizeof *b->faces);
    b->bone = (int *)malloc(4 * (size_t)b->nv * sizeof *b->bone);
    b->weight = (double *)malloc(4 * (size_t)b->nv * sizeof *b->weight);
    sum = (double *)malloc(4 * (size_t)b->nv * sizeof *sum);
    w.twin = (int *)malloc(3 * (size_t)b->nf * sizeof *w.twin);
    w.link = (int *)malloc(3 * (size_t)b->nf * sizeof *w.link);
    w.head = (int *)malloc((size_t)b->nv * sizeof *w.head);
    if (b->x == NULL || b->faces == NULL || b->bone == NULL || b->weight == NULL || sum == NULL ||
        w.twin == NULL || w.link == NULL || w.head == NULL)
        goto done;
    shapes_net(&g, b);
    shapes_even(b, sum);
    shapes_skin(b);
    result = shapes_sound(b, edge, &w);
done:
    free(g.phi);
    free(g.vertex);
    free(sum);
    free(w.twin);
    free(w.link);
    free(w.head);
    if (result < 1) shapes_body_free(b);
    return result;
}

/* The body with edges of about `edge` m (0.012 to 0.03: the hands need two cells): one closed
 * surface without handles. A grid whose planes graze the surface can make a bad mesh; then edges
 * 1 % shorter are tried, up to 20 times. Returns NULL or what went wrong; then *b is all zero. */
static inline const char *shapes_body_make(double edge, shapes_body *b) {
    int result = 0;
    memset(b, 0, sizeof *b);
    if (!(edge >= 0.012 && edge <= 0.03)) return "shapes_body_make: edge must be 0.012 to 0.03 m";
    for (int k = 0; k < 20 && result == 0; k++) {
        result = shapes_body_try(edge, b);
        edge *= 0.99;
    }
    return result > 0 ? NULL : result < 0 ? "out of memory" : "shapes_body_make: no sound mesh";
}

/* What each bone does to a point at rest, rows of [R | t], T [SHAPES_BONES x 12]: it turns by
 * turn[bone] = angles (rad) about x, then y, then z, through its joint and carries its children;
 * then all moves by shift (m). */
static inline void shapes_bones(const double (*turn)[3], const double shift[3], double *T) {
    for (int i = 0; i < SHAPES_BONES; i++) {
        const double *q = turn[i], *c = shapes_joint[i];
        double sx = sin(q[0]), cx = cos(q[0]), sy = sin(q[1]), cy = cos(q[1]);
        double sz = sin(q[2]), cz = cos(q[2]), *B = T + 12 * i;
        double A[9] = {cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
                       sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
                       -sy, cy * sx, cy * cx}, a[3];
        for (int r = 0; r < 3; r++)
            a[r] = c[r] - A[3 * r] * c[0] - A[3 * r + 1] * c[1] - A[3 * r + 2] * c[2];
        int p = shapes_parent[i];
        for (int r = 0; r < 3; r++) {
            if (p < 0) {
                memcpy(&B[4 * r], &A[3 * r], 3 * sizeof *A);
                B[4 * r + 3] = a[r] + shift[r];
                continue;
            }
            const double *P = T + 12 * p + 4 * r;
            for (int k = 0; k < 3; k++)
                B[4 * r + k] = P[0] * A[k] + P[1] * A[3 + k] + P[2] * A[6 + k];
            B[4 * r + 3] = P[3] + P[0] * a[0] + P[1] * a[1] + P[2] * a[2];
        }
    }
}

/* Poses x [nv x 3] by linear blend skinning with the bones that shapes_bones() makes. */
static inline void shapes_body_pose(const shapes_body *b, const double (*turn)[3],
                                    const double shift[3], double *x) {
    double T[12 * SHAPES_BONES];
    shapes_bones(turn, shift, T);
    for (int v = 0; v < b->nv; v++) for (int r = 0; r < 3; r++) {
        const double *p = b->x + 3 * v;
        double sum = 0;
        for (int k = 0; k < 4; k++) {
            const double *B = T + 12 * b->bone[4 * v + k] + 4 * r;
            sum += b->weight[4 * v + k] * (B[0] * p[0] + B[1] * p[1] + B[2] * p[2] + B[3]);
        }
        x[3 * v + r] = sum;
    }
}

/* Turns and shift of the body at time t >= 0 (s), and below x [nv x 3] m by them. It starts at rest
 * in the A-pose, takes up a walk of 1.1 s a cycle over the first second, and moves forward (+z) at
 * `speed` m/s once in stride: 0 stays on the spot, 1.2 suits the steps. Positions and velocities
 * are continuous. */
static inline void shapes_walk(double t, double speed, double (*turn)[3], double shift[3]) {
    double s = t < 0 ? 0 : t < 1 ? t : 1;
    double a = s * s * (3 - 2 * s), phase = 5.711986642890533 * t;      /* 2 pi / 1.1 s */
    double swing = a * sin(phase), low[2], drop;
    memset(turn, 0, SHAPES_BONES * sizeof *turn);
    for (int side = 0; side < 2; side++) {
        double sign = side ? -1 : 1, fore = sign * cos(phase);
        double lift = fore > 0 ? fore * fore : 0;
        double hip = -0.40 * sign * swing, knee = a * (0.08 + 0.62 * lift);
        turn[7 + side][0] = hip;
        turn[9 + side][0] = knee;
        turn[11 + side][0] = -0.7 * (hip + knee);
        turn[3 + side][0] = 0.38 * sign * swing;
        turn[3 + side][2] = -0.16 * sign * a;
        turn[5 + side][0] = -a * (0.22 + 0.12 * sign * sin(phase - 0.3));
        low[side] = 0.41 * (1 - cos(hip)) + 0.42 * (1 - cos(hip + knee));
    }
    turn[0][1] = -0.07 * swing;
    turn[1][1] = 0.15 * swing;
    turn[2][1] = -0.08 * swing;
    turn[1][0] = 0.03 * a;
    /* the leg that reaches lower stands on the floor: a smooth minimum of both lifts */
    drop = -0.012 * log(0.5 * (exp(-low[0] / 0.012) + exp(-low[1] / 0.012)));
    shift[0] = 0;
    shift[1] = -drop;
    shift[2] = speed * (t < 1 ? s * s * s - 0.5 * s * s * s * s : t - 0.5);
}

static inline void shapes_body_walk(const shapes_body *b, double t, double speed, double *x) {
    double turn[SHAPES_BONES][3], shift[3];
    shapes_walk(t, speed, turn, shift);
    shapes_body_pose(b, (const double (*)[3])turn, shift, x);
}

/* ===== the shirt ========================================================================= */

#define SHAPES_HEM  0.84            /* m, height of the hem                             */
#define SHAPES_CUFF 0.24            /* m along the arm from its joint                   */

static const double shapes_arm[3] = {0.76675, -0.64194, 0};             /* unit         */
static const double shapes_hole[3] = {0.99846, -0.05547, 0};             /* armhole plane */
static const double shapes_collar[2][3] = {                            /* neck planes  */
    {0, 0.90000, 0.43589}, {0, 0.99504, 0.09950}};                      /* front, back  */

static inline void shapes_shirt_free(shapes_shirt *s) {
    if (s == NULL) return;
    free(s->x);
    free(s->faces);
    free(s->X);
    free(s->panel);
    free(s->pins);
    memset(s, 0, sizeof *s);
}

static inline void shapes_drop(int v, shapes_sewing *w) {
    double p[3];
    memcpy(p, w->x + 3 * v, sizeof p);
    shapes_land(shapes_shirt_form(), p,
                (const double (*)[3])w->hold[v], w->holds[v] > 2 ? 2 : w->holds[v], 6);
    memcpy(w->x + 3 * v, p, sizeof p);
}

/* a new vertex at p, held in up to two planes (NULL: none) */
static inline int shapes_vertex(shapes_sewing *w, double px, double py, double pz,
                                const double *n0, const double *n1) {
    int v = w->nv++;
    w->x[3 * v] = px;
    w->x[3 * v + 1] = py;
    w->x[3 * v + 2] = pz;
    w->holds[v] = 0;
    memset(w->hold[v], 0, sizeof w->hold[v]);
    if (n0 != NULL) memcpy(w->hold[v][w->holds[v]++], n0, 3 * sizeof *n0);
    if (n1 != NULL) memcpy(w->hold[v][w->holds[v]++], n1, 3 * sizeof *n1);
    for (int k = 0; k < 4; k++) w->near[4 * v + k] = -1;
    return v;
}

/* a curve of n segments on the form: vertex a, n - 1 new ones in `plane`, vertex b; they start
 * on the chord bent by `bulge` along z and are spread evenly. Corners a, b stay. at: [n + 1] */
static inline void shapes_curve(shapes_sewing *w, int a, int b, int n, const double *plane,
                                double bulge, int *at) {
    at[0] = a;
    at[n] = b;
    for (int i = 1; i < n; i++) {
        double p[3], s = (double)i / n;
        for (int c = 0; c < 3; c++)
            p[c] = (1 - s) * w->x[3 * a + c] + s * w->x[3 * b + c];
        at[i] = shapes_vertex(w, p[0], p[1], p[2], plane, NULL);
        double bend[3] = {0, 0, bulge * sin(3.141592653589793 * s)};
        if (fabs(bulge) > 0) {
            shapes_keep(bend, (const double (*)[3])w->hold[at[i]], 1);
            for (int c = 0; c < 3; c++) w->x[3 * at[i] + c] += bend[c];
        }
        shapes_drop(at[i], w);
    }
    for (int pass = 0; pass < 30 * n; pass++) for (int i = 1; i < n; i++) {
        double *x = w->x + 3 * at[i];
        const double *l = w->x + 3 * at[i - 1], *r = w->x + 3 * at[i + 1];
        double d[3];
        for (int c = 0; c < 3; c++) d[c] = 0.5 * (l[c] + r[c]) - x[c];
        shapes_keep(d, (const double (*)[3])w->hold[at[i]], w->holds[at[i]]);
        for (int c = 0; c < 3; c++) x[c] += d[c];
        shapes_land(shapes_shirt_form(), x,
                    (const double (*)[3])w->hold[at[i]], w->holds[at[i]], 1);
    }
    for (int i = 1; i < n; i++) shapes_drop(at[i], w);
}

/* fills the inside of the part of a grid (row length cols) between rows j0, j1 and columns i0,
 * i1, whose rim is known: Coons' patch, dropped onto the form */
static inline void shapes_fill(shapes_sewing *w, int *g, int cols, int j0, int j1, int i0,
                               int i1) {
    const int *low = g + j0 * cols, *top = g + j1 * cols;
    for (int j = j0 + 1; j < j1; j++) for (int i = i0 + 1; i < i1; i++) {
        double u = (double)(i - i0) / (i1 - i0), v = (double)(j - j0) / (j1 - j0), p[3];
        const int *row = g + j * cols;
        for (int c = 0; c < 3; c++)
            p[c] = (1 - u) * w->x[3 * row[i0] + c] + u * w->x[3 * row[i1] + c] +
                   (1 - v) * w->x[3 * low[i] + c] + v * w->x[3 * top[i] + c] -
                   (1 - v) * ((1 - u) * w->x[3 * low[i0] + c] + u * w->x[3 * low[i1] + c]) -
                   v * ((1 - u) * w->x[3 * top[i0] + c] + u * w->x[3 * top[i1] + c]);
        int at = shapes_vertex(w, p[0], p[1], p[2], NULL, NULL);
        g[j * cols + i] = at;
        shapes_drop(at, w);
    }
}

/* every vertex of a grid that no plane holds is evened out between its four neighbours */
static inline void shapes_link(shapes_sewing *w, const int *g, int rows, int cols) {
    for (int j = 1; j + 1 < rows; j++) for (int i = 1; i + 1 < cols; i++) {
        int v = g[j * cols + i];
        if (v < 0 || w->holds[v] > 0) continue;
        w->near[4 * v] = g[j * cols + i - 1];
        w->near[4 * v + 1] = g[j * cols + i + 1];
        w->near[4 * v + 2] = g[(j - 1) * cols + i];
        w->near[4 * v + 3] = g[(j + 1) * cols + i];
    }
}

/* the seven corners of one half (sign 1: x > 0): hem, armpit, shoulder, neck, cuff below and
 * above */
static inline void shapes_corners(shapes_sewing *w, double sign, int at[6]) {
    static const double x[3] = {1, 0, 0}, y[3] = {0, 1, 0}, z[3] = {0, 0, 1};
    double hole[3] = {sign * shapes_hole[0], shapes_hole[1], 0};
    double cuff[3] = {sign * shapes_arm[0], shapes_arm[1], 0};
    double cx = 0.165 + SHAPES_CUFF * shapes_arm[0], cy = 1.40 + SHAPES_CUFF * shapes_arm[1];
    at[0] = shapes_vertex(w, sign * 0.20, SHAPES_HEM, 0, z, y);
    at[1] = shapes_vertex(w, sign * 0.215, 1.25, 0, z, hole);
    at[2] = shapes_vertex(w, sign * 0.2255, 1.44, 0, z, hole);
    at[3] = shapes_vertex(w, sign * 0.095, 1.48, 0, z, x);
    at[4] = shapes_vertex(w, sign * (cx + 0.078 * shapes_arm[1]), cy - 0.078 * shapes_arm[0], 0,
                          z, cuff);
    at[5] = shapes_vertex(w, sign * (cx - 0.078 * shapes_arm[1]), cy + 0.078 * shapes_arm[0], 0,
                          z, cuff);
    for (int i = 0; i < 6; i++) {
        for (int r = 0; r < 4; r++) shapes_drop(at[i], w);
        w->holds[at[i]] = 3;
    }
}

/* copies a curve [n + 1] into a grid from place `from` on with a stride */
static inline void shapes_lay(int *g, int from, int stride, const int *curve, int n) {
    for (int i = 0; i <= n; i++) g[from + i * stride] = curve[i];
}

/* all curves and patches; line [4 x (longest curve)] is scratch */
static inline void shapes_patches(shapes_sewing *w, int *line, int *pins, int *npins) {
    static const double z[3] = {0, 0, 1}, y[3] = {0, 1, 0};
    int corner[2][6], cols = w->n + 1, rows = w->na + w->nb + 1, half = w->kp + w->nb;
    int wide = 2 * half + 1;
    for (int s = 0; s < 2; s++) shapes_corners(w, s ? -1 : 1, corner[s]);
    for (int s = 0; s < 2; s++) {
        const int *c = corner[s];
        double sign = s ? -1 : 1, hole[3] = {sign * shapes_hole[0], shapes_hole[1], 0};
        double cuff[3] = {sign * shapes_arm[0], shapes_arm[1], 0};
        int edge = s ? 0 : cols - 1, in = s ? 1 : -1, *g = w->sleeve[s];
        int pit = edge + in * w->kp;
        shapes_curve(w, c[0], c[1], w->na, z, 0, line);                 /* side seam     */
        for (int k = 0; k < 2; k++) shapes_lay(w->torso[k], edge, cols, line, w->na);
        shapes_curve(w, c[2], c[3], w->ks, z, 0, line);                 /* shoulder seam */
        for (int k = 0; k < 2; k++)
            shapes_lay(w->torso[k], (rows - 1) * cols + pit, in, line, w->ks);
        for (int i = 0; i <= w->ks; i++) pins[(*npins)++] = line[i];
        shapes_curve(w, c[4], c[1], w->nc, z, 0, line);                 /* under the arm */
        shapes_lay(g, 0, wide, line, w->nc);
        shapes_lay(g, wide - 1, wide, line, w->nc);
        for (int k = 0; k < 2; k++) {
            double bulge = k ? -0.12 : 0.12;
            int from = k ? wide - 1 : 0, on = k ? -1 : 1;
            shapes_curve(w, c[1], c[2], half, hole, bulge, line);       /* armhole       */
            shapes_lay(w->torso[k], w->na * cols + edge, in, line, w->kp);
            shapes_lay(w->torso[k], w->na * cols + pit, cols, line + w->kp, w->nb);
            shapes_lay(g, w->nc * wide + from, on, line, half);
            shapes_curve(w, c[4], c[5], half, cuff, bulge, line);
            shapes_lay(g, from, on, line, half);
        }
    }
    for (int k = 0; k < 2; k++) {
        double bulge = k ? -0.13 : 0.13;
        int *g = w->torso[k], kp = w->kp, neck = w->n - 2 * w->ks - 2 * kp;
        shapes_curve(w, corner[1][0], corner[0][0], w->n, y, bulge, line);
        shapes_lay(g, 0, 1, line, w->n);
        shapes_curve(w, corner[1][3], corner[0][3], neck, shapes_collar[k], bulge, line);
        shapes_lay(g, (rows - 1) * cols + kp + w->ks, 1, line, neck);
        shapes_curve(w, g[w->na * cols + kp], g[w->na * cols + w->n - kp], w->n - 2 * kp, NULL,
                     0.5 * bulge, line);
        shapes_lay(g, w->na * cols + kp, 1, line, w->n - 2 * kp);
        shapes_fill(w, g, cols, 0, w->na, 0, w->n);
        shapes_fill(w, g, cols, w->na, rows - 1, kp, w->n - kp);
        shapes_link(w, g, rows, cols);
    }
    for (int s = 0; s < 2; s++) {
        shapes_fill(w, w->sleeve[s], wide, 0, w->nc, 0, wide - 1);
        shapes_link(w, w->sleeve[s], w->nc + 1, wide);
    }
}

/* whether cell (i, j) of a grid has all its corners */
static inline int shapes_whole(const int *g, int cols, int i, int j) {
    const int *q = g + j * cols + i;
    return q[0] >= 0 && q[1] >= 0 && q[cols] >= 0 && q[cols + 1] >= 0;
}

/* two triangles a cell, diagonals alternating; turned over where `flip` */
static inline void shapes_faces(shapes_sewing *w, const int *g, int rows, int cols, int flip,
                                int panel) {
    static const int split[2][2][3] = {{{0, 1, 3}, {0, 3, 2}}, {{0, 1, 2}, {1, 3, 2}}};
    for (int j = 0; j + 1 < rows; j++) for (int i = 0; i + 1 < cols; i++) {
        if (!shapes_whole(g, cols, i, j)) continue;
        for (int t = 0; t < 2; t++, w->nf++) for (int k = 0; k < 3; k++) {
            int q = split[(i + j) & 1][t][flip ? 2 - k : k];
            int p = (j + q / 2) * cols + i + q % 2;
            w->spot[3 * w->nf + k] = p;
            w->faces[3 * w->nf + k] = g[p];
            w->panel[w->nf] = panel;
        }
    }
}

/* first guess of a panel in the plane: lengths along the rows from the middle column (row 0's for
 * all where `rigid`: a sleeve), and along the columns from row 0. flat: [rows x cols x 2] */
static inline void shapes_unroll(const shapes_sewing *w, const int *g, int rows, int cols,
                                 double sign, int rigid, double *flat) {
    int mid = cols / 2;
    for (int j = 0; j < rows; j++) for (int k = 0; k < cols; k++) {
        int i = k <= cols - 1 - mid ? mid + k : cols - 1 - k;
        double *p = flat + 2 * (j * cols + i);
        int back = i > mid ? i - 1 : i + 1;
        if (g[j * cols + i] < 0) continue;
        int r = rigid ? 0 : j;
        p[0] = i == mid ? 0 : flat[2 * (j * cols + back)] + (i > mid ? sign : -sign) *
                              shapes_length(w->x, g[r * cols + i], g[r * cols + back], 3);
        p[1] = j == 0 ? 0 : flat[2 * ((j - 1) * cols + i) + 1] +
                            shapes_length(w->x, g[j * cols + i], g[(j - 1) * cols + i], 3);
    }
}

/* one edge of the flattening, pulled half way to its length in space */
static inline void shapes_pull(double *flat, int a, int b, double want) {
    double l = shapes_length(flat, a, b, 2), k = l > 1e-12 ? 0.25 * (l - want) / l : 0;
    for (int c = 0; c < 2; c++) {
        double d = k * (flat[2 * b + c] - flat[2 * a + c]);
        flat[2 * a + c] += d;
        flat[2 * b + c] -= d;
    }
}

/* whether an edge lies inside one panel, not on a seam or the rim */
static inline int shapes_inside(const shapes_sewing *w, int h) {
    int t = w->twin[h];
    return t >= 0 && w->panel[h / 3] == w->panel[t / 3] &&
           w->spot[h] == w->spot[shapes_next(t)] && w->spot[shapes_next(h)] == w->spot[t];
}

/* cotangent of the corner opposite a half-edge */
static inline double shapes_cot(const shapes_sewing *w, int h) {
    const double *a = w->x + 3 * w->faces[h], *b = w->x + 3 * w->faces[shapes_next(h)];
    const double *c = w->x + 3 * w->faces[shapes_next(shapes_next(h))];
    double u[3], v[3], dot = 0, uu = 0, vv = 0;
    for (int i = 0; i < 3; i++) {
        u[i] = a[i] - c[i];
        v[i] = b[i] - c[i];
        dot += u[i] * v[i];
        uu += u[i] * u[i];
        vv += v[i] * v[i];
    }
    double area = sqrt(fmax(uu * vv - dot * dot, 1e-24));
    return dot / area;
}

/* swaps the diagonal of two triangles a b c and b a d where the angles at c and d sum to more
 * than a straight one (Delaunay's rule, with some play so that squares stay), once a face and
 * sweep: `len` marks the faces done. Returns the number of swaps. */
static inline int shapes_swap(shapes_sewing *w) {
    int swaps = 0;
    shapes_twins(w);
    for (int f = 0; f < w->nf; f++) w->len[f] = 0;
    for (int h = 0; h < 3 * w->nf; h++) {
        int t = w->twin[h], f = h / 3, g = t / 3, c = shapes_next(shapes_next(h));
        if (t < h || !shapes_inside(w, h) || w->len[f] > 0 || w->len[g] > 0) continue;
        int d = shapes_next(shapes_next(t)), n = shapes_next(h), v[4], s[4];
        if (shapes_cot(w, h) + shapes_cot(w, t) > -0.15) continue;
        if (shapes_find(w, w->faces[c], w->faces[d]) >= 0) continue;
        const int at[4] = {h, n, c, d};
        for (int k = 0; k < 4; k++) {
            v[k] = w->faces[at[k]];
            s[k] = w->spot[at[k]];
        }
        static const int to[2][3] = {{3, 1, 2}, {2, 0, 3}};
        for (int k = 0; k < 3; k++) {
            w->faces[3 * f + k] = v[to[0][k]];
            w->spot[3 * f + k] = s[to[0][k]];
            w->faces[3 * g + k] = v[to[1][k]];
            w->spot[3 * g + k] = s[to[1][k]];
        }
        w->len[f] = w->len[g] = 1;
        swaps++;
    }
    return swaps;
}

/* moves each free vertex towards the area-weighted mean of its triangles' centres, along the
 * form; sum [nv x 4] is scratch */
static inline void shapes_centre(shapes_sewing *w, double *sum) {
    memset(sum, 0, 4 * (size_t)w->nv * sizeof *sum);
    for (int f = 0; f < w->nf; f++) {
        const int *q = w->faces + 3 * f;
        const double *a = w->x + 3 * q[0], *b = w->x + 3 * q[1], *c = w->x + 3 * q[2];
        double u[3], v[3], dot = 0, uu = 0, vv = 0;
        for (int i = 0; i < 3; i++) {
            u[i] = b[i] - a[i];
            v[i] = c[i] - a[i];
            dot += u[i] * v[i];
            uu += u[i] * u[i];
            vv += v[i] * v[i];
        }
        double area = sqrt(fmax(uu * vv - dot * dot, 0));
        for (int k = 0; k < 3; k++) {
            for (int i = 0; i < 3; i++)
                sum[4 * q[k] + i] += area * (a[i] + b[i] + c[i]) / 3;
            sum[4 * q[k] + 3] += area;
        }
    }
    for (int v = 0; v < w->nv; v++) {
        if (w->holds[v] > 0) continue;
        for (int i = 0; i < 3; i++)
            w->x[3 * v + i] += 0.8 * (sum[4 * v + i] / sum[4 * v + 3] - w->x[3 * v + i]);
        shapes_land(shapes_shirt_form(), w->x + 3 * v, NULL, 0, 2);
    }
}

/* lays a panel flat: its edges, relaxed in the plane towards their lengths in space */
static inline void shapes_relax(shapes_sewing *w, int panel) {
    for (int h = 0; h < 3 * w->nf; h++)
        w->len[h] = shapes_length(w->x, w->faces[h], w->faces[shapes_next(h)], 3);
    for (int pass = 0; pass < 40 * w->n; pass++)
        for (int i = 0; i < 3 * w->nf; i++) {
            int h = pass & 1 ? 3 * w->nf - 1 - i : i;
            if (w->panel[h / 3] != panel || (w->twin[h] > h && shapes_inside(w, h))) continue;
            shapes_pull(w->flat, w->spot[h], w->spot[shapes_next(h)], w->len[h]);
        }
}

/* pattern coordinates of a panel, shifted by dx along the table */
static inline void shapes_pattern(shapes_sewing *w, const int *g, int rows, int cols, double sign,
                                  double dx, int panel, double *X) {
    shapes_unroll(w, g, rows, cols, sign, panel > 1, w->flat);
    shapes_relax(w, panel);
    for (int h = 0; h < 3 * w->nf; h++) {
        if (w->panel[h / 3] != panel) continue;
        X[2 * h] = w->flat[2 * w->spot[h]] + dx;
        X[2 * h + 1] = w->flat[2 * w->spot[h] + 1];
    }
}

/* evens out the patches' insides over the form */
static inline void shapes_settle(shapes_sewing *w) {
    for (int pass = 0; pass < 160; pass++) for (int v = 0; v < w->nv; v++) {
        const int *q = w->near + 4 * v;
        double *x = w->x + 3 * v;
        if (q[0] < 0) continue;
        for (int c = 0; c < 3; c++)
            x[c] = 0.25 * (w->x[3 * q[0] + c] + w->x[3 * q[1] + c] + w->x[3 * q[2] + c] +
                           w->x[3 * q[3] + c]);
        shapes_land(shapes_shirt_form(), x, NULL, 0, 1);
    }
    for (int v = 0; v < w->nv; v++) if (w->near[4 * v] >= 0) shapes_drop(v, w);
}

static inline void shapes_sewing_free(shapes_sewing *w) {
    free(w->hold);
    free(w->holds);
    free(w->near);
    for (int k = 0; k < 2; k++) {
        free(w->torso[k]);
        free(w->sleeve[k]);
    }
    free(w->flat);
    free(w->spot);
    free(w->twin);
    free(w->head);
    free(w->link);
    free(w->len);
}

/* counts for an edge length, and room for everything; 0 when there is no memory */
static inline int shapes_sewing_open(shapes_sewing *w, double edge, shapes_shirt *s) {
    w->ks = (int)fmax(1, floor(0.12 / edge + 0.5));
    w->kp = (int)fmax(1, floor(0.04 / edge + 0.5));
    w->n = 2 * (int)fmax(w->kp + w->ks + 2, floor(0.29 / edge + 0.5));
    w->na = (int)fmax(2, floor(0.40 / edge + 0.5));
    w->nb = (int)fmax(2, floor(0.20 / edge + 0.5));
    w->nc = (int)fmax(2, floor(0.16 / edge + 0.5));
    size_t torso = (size_t)(w->n + 1) * (size_t)(w->na + w->nb + 1);
    size_t sleeve = (size_t)(2 * (w->kp + w->nb) + 1) * (size_t)(w->nc + 1);
    size_t cap = 2 * (torso + sleeve);
    s->x = w->x = (double *)malloc(3 * cap * sizeof *w->x);
    s->faces = w->faces = (int *)malloc(6 * cap * sizeof *w->faces);
    s->panel = w->panel = (int *)malloc(2 * cap * sizeof *w->panel);
    s->X = (double *)malloc(12 * cap * sizeof *s->X);
    s->pins = (int *)malloc(2 * (size_t)(w->ks + 1) * sizeof *s->pins);
    w->hold = (double (*)[2][3])malloc(cap * sizeof *w->hold);
    w->holds = (int *)malloc(cap * sizeof *w->holds);
    w->near = (int *)malloc(4 * cap * sizeof *w->near);
    w->flat = (double *)malloc(2 * cap * sizeof *w->flat);
    w->spot = (int *)malloc(6 * cap * sizeof *w->spot);
    w->twin = (int *)malloc(6 * cap * sizeof *w->twin);
    w->head = (int *)malloc(cap * sizeof *w->head);
    w->link = (int *)malloc(6 * cap * sizeof *w->link);
    w->len = (double *)malloc(6 * cap * sizeof *w->len);
    for (int k = 0; k < 2; k++) {
        w->torso[k] = (int *)malloc(torso * sizeof *w->torso[k]);
        w->sleeve[k] = (int *)malloc(sleeve * sizeof *w->sleeve[k]);
        for (size_t i = 0; w->torso[k] != NULL && i < torso; i++) w->torso[k][i] = -1;
        for (size_t i = 0; w->sleeve[k] != NULL && i < sleeve; i++) w->sleeve[k][i] = -1;
    }
    return s->x != NULL && s->faces != NULL && s->panel != NULL && s->X != NULL &&
           s->pins != NULL && w->hold != NULL && w->holds != NULL && w->near != NULL &&
           w->flat != NULL && w->spot != NULL && w->twin != NULL && w->head != NULL &&
           w->link != NULL && w->len != NULL && w->torso[0] != NULL && w->torso[1] != NULL &&
           w->sleeve[0] != NULL && w->sleeve[1] != NULL;
}

/* The shirt with edges of about `edge` m (0.005 to 0.05), around the body in its rest pose and
 * free of it. Returns NULL or what went wrong; then *s is all zero. */
static inline const char *shapes_shirt_make(double edge, shapes_shirt *s) {
    const char *error = "out of memory";
    shapes_sewing w;
    int *line = NULL;
    memset(s, 0, sizeof *s);
    memset(&w, 0, sizeof w);
    if (!(edge >= 0.005 && edge <= 0.05)) return "shapes_shirt_make: edge must be 0.005 to 0.05 m";
    if (!shapes_sewing_open(&w, edge, s)) goto done;
    line = (int *)malloc((size_t)(w.n + w.na + w.nb + 2) * sizeof *line);
    if (line == NULL) goto done;
    shapes_patches(&w, line, s->pins, &s->npins);
    shapes_settle(&w);
    {
        int rows = w.na + w.nb + 1, cols = w.n + 1, wide = 2 * (w.kp + w.nb) + 1;
        for (int k = 0; k < 2; k++) shapes_faces(&w, w.torso[k], rows, cols, k == 1, k);
        for (int k = 0; k < 2; k++)
            shapes_faces(&w, w.sleeve[k], w.nc + 1, wide, k == 1, 2 + k);
        for (int pass = 0; pass < 60; pass++) {
            shapes_swap(&w);
            shapes_centre(&w, w.len);
        }
        shapes_twins(&w);
        for (int k = 0; k < 2; k++)
            shapes_pattern(&w, w.torso[k], rows, cols, k ? -1 : 1, 0.7 * k, k, s->X);
        for (int k = 0; k < 2; k++)
            shapes_pattern(&w, w.sleeve[k], w.nc + 1, wide, k ? -1 : 1, 1.35 + 0.6 * k, 2 + k,
                           s->X);
    }
    s->nv = w.nv;
    s->nf = w.nf;
    error = NULL;
done:
    free(line);
    shapes_sewing_free(&w);
    if (error != NULL) shapes_shirt_free(s);
    return error;
}

#endif
