/* figure.h - a skinned body for the programs of this folder: by formula, or from files.
 * SPDX-License-Identifier: MIT
 *
 *     figure      f;
 *     const char *error = figure_make(0.029, &f);                     ../shapes.h: nothing to load
 *              or figure_load("body.obj", "weights.txt", "motion.skin", &f);
 *     figure_body(&f, &desc);                                         into a kdsm_desc
 *     figure_walk(&f, t, T);                                          joints [f.njoints x 12]
 *     figure_free(&f);
 *
 * Weights: a line 'vertex joint weight' each, # comments. Motion: 8 bytes, then uint32 frames,
 * joints and two more, then frames x joints x 12 floats, rows of [R | t], 120 Hz.
 */
#ifndef KDSM_EXAMPLE_FIGURE_H
#define KDSM_EXAMPLE_FIGURE_H

#include "kdsm.h"
#include "../shapes.h"
#include <stdio.h>

#define FIGURE_INFLUENCES 8         /* of files, those of the largest weight            */

typedef struct figure {
    shapes_body   shape;            /* by formula                                       */
    cloth_mesh   *mesh;             /* from files                                       */
    int           nv, nf, njoints, influences;
    const double *x;
    const int    *faces, *joint;
    const double *weight;
    int           frames;
    float        *skin;             /* [frames x njoints x 12]                          */
    int          *own_joint;
    double       *own_weight;
} figure;

static inline void figure_free(figure *f) {
    shapes_body_free(&f->shape);
    cloth_mesh_destroy(NULL, f->mesh);
    free(f->skin);
    free(f->own_joint);
    free(f->own_weight);
    memset(f, 0, sizeof *f);
}

/* The body of shapes.h with edges of about `edge` m. Returns NULL or what went wrong. */
static inline const char *figure_make(double edge, figure *f) {
    const char *error;
    memset(f, 0, sizeof *f);
    error = shapes_body_make(edge, &f->shape);
    f->nv = f->shape.nv, f->nf = f->shape.nf, f->x = f->shape.x, f->faces = f->shape.faces;
    f->joint = f->shape.bone, f->weight = f->shape.weight;
    f->njoints = SHAPES_BONES, f->influences = 4;
    return error;
}

/* A weight into the largest FIGURE_INFLUENCES of a vertex. */
static inline void figure_weigh(figure *f, int vertex, int joint, double weight) {
    int    *j = f->own_joint + (size_t)vertex * FIGURE_INFLUENCES;
    double *w = f->own_weight + (size_t)vertex * FIGURE_INFLUENCES;
    int     k = FIGURE_INFLUENCES - 1;
    if (!(weight > w[k])) return;
    for (; k > 0 && weight > w[k - 1]; k--) j[k] = j[k - 1], w[k] = w[k - 1];
    j[k] = joint, w[k] = weight;
}

static inline const char *figure_read_motion(const char *path, figure *f) {
    char        head[24];
    uint32_t    n[4];
    size_t      count;
    const char *error = "the motion file does not fit its head";
    FILE       *in = fopen(path, "rb");
    if (!in) return "the motion file cannot be opened";
    free(f->skin);
    f->skin = NULL;
    if (fread(head, 1, 24, in) != 24) goto done;
    memcpy(n, head + 8, sizeof n);
    if (n[0] < 2 || n[0] > 100000 || n[1] < 1 || n[1] > 1000) goto done;
    f->frames = (int)n[0], f->njoints = (int)n[1];
    count = 12 * (size_t)n[0] * n[1];
    f->skin = (float *)malloc(count * sizeof *f->skin);
    if (f->skin && fread(f->skin, sizeof *f->skin, count, in) == count) error = NULL;
done:
    fclose(in);
    return error;
}

static inline const char *figure_read_weights(const char *path, figure *f) {
    char        line[256];
    const char *error = NULL;
    FILE       *in = fopen(path, "r");
    if (!in) return "the weights cannot be opened";
    while (!error && fgets(line, sizeof line, in)) {
        int    vertex, joint;
        double weight;
        if (line[0] == '#') continue;
        if (sscanf(line, "%d %d %lf", &vertex, &joint, &weight) != 3) continue;
        if (vertex < 0 || vertex >= f->nv || joint < 0 || joint >= f->njoints)
            error = "the weights do not fit body and motion";
        else figure_weigh(f, vertex, joint, weight);
    }
    fclose(in);
    return error;
}

static inline const char *figure_load(const char *body, const char *weights, const char *motion,
                                      figure *f) {
    const char *error;
    memset(f, 0, sizeof *f);
    if (cloth_obj_load(NULL, body, NULL, &f->mesh)) return "the body's OBJ cannot be read";
    f->nv = f->mesh->nv, f->nf = f->mesh->nf, f->x = f->mesh->x, f->faces = f->mesh->faces;
    f->influences = FIGURE_INFLUENCES;
    f->own_joint = (int *)calloc((size_t)f->nv * FIGURE_INFLUENCES, sizeof(int));
    f->own_weight = (double *)calloc((size_t)f->nv * FIGURE_INFLUENCES, sizeof(double));
    f->joint = f->own_joint, f->weight = f->own_weight;
    if (!f->own_joint || !f->own_weight) return "out of memory";
    error = figure_read_motion(motion, f);
    return error ? error : figure_read_weights(weights, f);
}

static inline void figure_body(const figure *f, kdsm_desc *desc) {
    desc->nv = f->nv, desc->x = f->x, desc->nf = f->nf, desc->faces = f->faces;
    desc->njoints = f->njoints, desc->influences = f->influences;
    desc->joint = f->joint, desc->weight = f->weight;
}

/* The joints at time t >= 0, s: at rest first. Files are held at their end. */
static inline void figure_walk(const figure *f, double t, double *T) {
    double turn[SHAPES_BONES][3], shift[3], at, part;
    int    frame, i, n = 12 * f->njoints;
    if (!f->skin) {
        shapes_walk(t, 0, turn, shift);
        shapes_bones((const double (*)[3])turn, shift, T);
        return;
    }
    at = fmin(120 * t, f->frames - 1);
    frame = (int)at < f->frames - 1 ? (int)at : f->frames - 2;
    part = at - frame;
    for (i = 0; i < n; i++) {
        const double a = (double)f->skin[(size_t)frame * (size_t)n + (size_t)i];
        const double b = (double)f->skin[(size_t)(frame + 1) * (size_t)n + (size_t)i];
        T[i] = a + part * (b - a);
    }
}

/* The body itself, x [nv x 3], under the joints T. */
static inline void figure_skin(const figure *f, const double *T, double *x) {
    int v, k, r;
    for (v = 0; v < f->nv; v++) {
        const double *p = f->x + 3 * (size_t)v;
        double        sum = 0, out[3] = {0, 0, 0};
        for (k = 0; k < f->influences; k++) {
            const size_t  at = (size_t)v * (size_t)f->influences + (size_t)k;
            const double *B = T + 12 * (size_t)f->joint[at];
            sum += f->weight[at];
            for (r = 0; r < 3; r++)
                out[r] += f->weight[at] * (B[4 * r] * p[0] + B[4 * r + 1] * p[1]
                                           + B[4 * r + 2] * p[2] + B[4 * r + 3]);
        }
        for (r = 0; r < 3; r++) x[3 * (size_t)v + (size_t)r] = out[r] / sum;
    }
}

/* A number of [-1, 1) by seed and index (splitmix64). */
static inline double figure_random(uint64_t seed, int i) {
    uint64_t z = (seed << 16) + ((uint64_t)i + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (double)((z ^ z >> 31) >> 11) / 4503599627370496.0 - 1;
}

/* Angles of the body by formula at random, `amount` of what a person can: arms, trunk, legs; 0: at
 * rest. turn [SHAPES_BONES] */
static inline void figure_angles(uint64_t seed, double amount, double (*turn)[3]) {
    /* the largest turn of each bone, about x, y and z, radians, and the middle of its range */
    static const double most[SHAPES_BONES][3] = {
        {0.1, 0.2, 0.1}, {0.3, 0.4, 0.2}, {0.3, 0.4, 0.2}, {0.7, 0.4, 0.4}, {0.7, 0.4, 0.4},
        {0.5, 0.7, 0.0}, {0.5, 0.7, 0.0}, {0.7, 0.2, 0.2}, {0.7, 0.2, 0.2}, {0.6, 0.0, 0.0},
        {0.6, 0.0, 0.0}, {0.3, 0.1, 0.1}, {0.3, 0.1, 0.1}};
    static const double middle[SHAPES_BONES][3] = {
        {0, 0, 0}, {0.1, 0, 0}, {0, 0, 0}, {0, 0, -0.15}, {0, 0, 0.15}, {-0.5, 0, 0}, {-0.5, 0, 0},
        {-0.2, 0, 0}, {-0.2, 0, 0}, {0.6, 0, 0}, {0.6, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    int i, k;
    for (i = 0; i < SHAPES_BONES; i++)
        for (k = 0; k < 3; k++)
            turn[i][k] = amount * (most[i][k] * figure_random(seed, 3 * i + k)
                                   + middle[i][k]);
}

/* The joints at the angles `part` of the way from a to b. */
static inline void figure_between(const double (*a)[3], const double (*b)[3], double part,
                                  double *T) {
    double turn[SHAPES_BONES][3], shift[3] = {0, 0, 0};
    int    i;
    for (i = 0; i < 3 * SHAPES_BONES; i++)
        turn[i / 3][i % 3] = (1 - part) * a[i / 3][i % 3] + part * b[i / 3][i % 3];
    shapes_bones((const double (*)[3])turn, shift, T);
}

static inline void figure_pose(uint64_t seed, double amount, double *T) {
    double turn[SHAPES_BONES][3];
    figure_angles(seed, amount, turn);
    figure_between((const double (*)[3])turn, (const double (*)[3])turn, 0, T);
}

#endif
