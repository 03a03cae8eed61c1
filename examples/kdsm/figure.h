/* figure.h - a skinned body for the programs of this folder: by formula, or from files.
 * SPDX-License-Identifier: MIT
 *
 *     figure      f;
 *     const char *error = figure_make(0.029, &f);                     ../shapes.h: nothing to load
 *              or figure_load("body.obj", "weights.txt", "motion.skin", &f);
 *     figure_body(&f, &desc);                                         into a kdsm_desc
 *     figure_walk(&f, t, T);                                          joints [f.njoints x 12]
 *     figure_angles(&f, seed, 1, turn), figure_at(&f, turn, T);       joints at random angles
 *     error = figure_arms_out(&f);                                    a T-pose is the rest now
 *     figure_free(&f);
 *
 * Weights: a line 'vertex joint weight' each, # comments. Motion: 8 bytes, then uint32 frames,
 * joints, 120 and the frames at the start that only lead in, then frames x joints x 12 floats, rows
 * of [R | t], 120 Hz. Skeleton, for angles at random: a line 'joint name parent x y z' each, the
 * parent -1 or smaller, x y z where the joint is at rest (behind it where the bone ends: needed of
 * LeftArm and RightArm for a T-pose); angles are of what the motions span.
 * checked: tests/test_kdsm.c: joints_of_a_skeleton, motion_by_its_angles
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
    int           frames, lead;     /* of the motion; those that only lead in           */
    float        *skin;             /* [frames x njoints x 12]                          */
    int          *parent;           /* of a skeleton [njoints]                          */
    double       *head;             /* [njoints x 3]                                    */
    double      (*range)[2][3];     /* [njoints] least and largest turn                 */
    int           arm[2];           /* joints of the upper arms, -1: not known          */
    double        reach[2][3];      /* where each goes at rest                          */
    double       *own_x, *back;     /* of another rest: the body there; joints to it, turned
                                     * round [njoints x 12]                             */
    int          *own_joint;
    double       *own_weight;
    char          said[400];        /* what is wrong with a file                        */
} figure;

static inline void figure_free(figure *f) {
    shapes_body_free(&f->shape);
    cloth_mesh_destroy(NULL, f->mesh);
    free(f->skin), free(f->parent), free(f->head), free(f->range);
    free(f->own_joint), free(f->own_weight), free(f->own_x), free(f->back);
    memset(f, 0, sizeof *f);
}

/* The body of shapes.h with edges of about `edge` m. Returns NULL or what went wrong. */
static inline const char *figure_make(double edge, figure *f) {
    const char *error;
    int         k;
    memset(f, 0, sizeof *f);
    error = shapes_body_make(edge, &f->shape);
    f->nv = f->shape.nv, f->nf = f->shape.nf, f->x = f->shape.x, f->faces = f->shape.faces;
    f->joint = f->shape.bone, f->weight = f->shape.weight;
    f->njoints = SHAPES_BONES, f->influences = 4;
    for (k = 0; k < 2; k++) {               /* the one of +x first */
        f->arm[k] = 3 + k;
        memcpy(f->reach[k], shapes_arm, sizeof shapes_arm);
        f->reach[k][0] *= k ? -1 : 1;
    }
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

/* The first motion says how many joints there are: arrays and weights are of so many. */
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
    if (f->njoints && n[1] != (uint32_t)f->njoints) {
        sprintf(f->said, "%.300s: a motion of %d joints, the body has %d", path, (int)n[1],
                f->njoints);
        error = f->said;
        goto done;
    }
    f->frames = (int)n[0], f->njoints = (int)n[1];
    f->lead = n[3] < n[0] ? (int)n[3] : 0;
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
    int         v;
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
    for (v = 0; v < f->nv && !error; v++) {
        if (f->own_weight[(size_t)v * FIGURE_INFLUENCES] > 0) continue;
        sprintf(f->said, "%.300s: vertex %d has no weight", path, v);
        error = f->said;
    }
    return error;
}

static inline const char *figure_load(const char *body, const char *weights, const char *motion,
                                      figure *f) {
    const char *error;
    memset(f, 0, sizeof *f);
    if (cloth_obj_load(NULL, body, NULL, &f->mesh)) return "the body's OBJ cannot be read";
    f->nv = f->mesh->nv, f->nf = f->mesh->nf, f->x = f->mesh->x, f->faces = f->mesh->faces;
    f->influences = FIGURE_INFLUENCES, f->arm[0] = f->arm[1] = -1;
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

/* Joints told against the rest as it was made, to those against the rest as it is: T back. */
static inline void figure_against(const figure *f, double *T) {
    int j, r, c, k;
    for (j = 0; j < f->njoints && f->back; j++) {
        const double *B = f->back + 12 * j;
        double        M[12];
        for (r = 0; r < 3; r++)
            for (c = 0; c < 4; c++) {
                M[4 * r + c] = c == 3 ? T[12 * j + 4 * r + 3] : 0;
                for (k = 0; k < 3; k++) M[4 * r + c] += T[12 * j + 4 * r + k] * B[4 * k + c];
            }
        memcpy(T + 12 * j, M, sizeof M);
    }
}

/* The joints at time t >= 0, s: at rest first. Files are held at their end. */
static inline void figure_walk(const figure *f, double t, double *T) {
    double turn[SHAPES_BONES][3], shift[3], at, part;
    int    frame, i, n = 12 * f->njoints;
    if (!f->skin) {
        shapes_walk(t, 0, turn, shift);
        shapes_bones((const double (*)[3])turn, shift, T);
        figure_against(f, T);
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
    figure_against(f, T);
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

/* ----- angles: turn [njoints x 3], of a joint against its parent, axis times angle; of the body by
 * formula those of shapes.h -------------------------------------------------------------- */

/* The vector of a rotation R, rows: its axis, as long as its angle, which is below pi. */
static inline void figure_vector(const double *R, double *v) {
    const double a[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]};
    const double sine = 0.5 * sqrt(kdsmi_dot(a, a)), cosine = 0.5 * (R[0] + R[4] + R[8] - 1);
    const double by = sine > 1e-9 ? 0.5 * atan2(sine, cosine) / sine : 0.5;
    int          c;
    for (c = 0; c < 3; c++) v[c] = by * a[c];
}

/* R = cos l + (1 - cos l) a a' + sin l [a]x,  v = l a                          [Rodrigues] */
static inline void figure_rotation(const double *v, double *R) {
    const double l = sqrt(kdsmi_dot(v, v)), by = l > 1e-9 ? sin(l) / l : 1;
    const double part = l > 1e-9 ? (1 - cos(l)) / (l * l) : 0.5;
    const double cross[9] = {0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0};
    int          k;
    for (k = 0; k < 9; k++)
        R[k] = (k % 4 ? 0 : cos(l)) + part * v[k / 3] * v[k % 3] + by * cross[k];
}

/* How J [12] turns in the frame of P [12], NULL: in space. */
static inline void figure_between_frames(const double *P, const double *J, double *v) {
    double R[9];
    int    r, c, k;
    for (r = 0; r < 3; r++)
        for (c = 0; c < 3; c++) {
            double sum = P ? 0 : J[4 * r + c];
            for (k = 0; k < 3 && P; k++) sum += P[4 * k + r] * J[4 * k + c];
            R[3 * r + c] = sum;
        }
    figure_vector(R, v);
}

/* How joint j turns in the frame of its parent p, -1: in space. T [njoints x 12] */
static inline void figure_turn(const double *T, int p, int j, double *v) {
    figure_between_frames(p < 0 ? NULL : T + 12 * p, T + 12 * j, v);
}

/* The joints T [njoints x 12] at the angles `turn`; the root stays where it is at rest. */
static inline void figure_at(const figure *f, const double *turn, double *T) {
    const double shift[3] = {0, 0, 0};
    int          j, r, c, k;
    if (!f->parent) {
        double angle[SHAPES_BONES][3];
        memcpy(angle, turn, sizeof angle);
        shapes_bones((const double (*)[3])angle, shift, T);
        figure_against(f, T);
        return;
    }
    for (j = 0; j < f->njoints; j++) {
        const double *h = f->head + 3 * j, *P = f->parent[j] < 0 ? NULL : T + 12 * f->parent[j];
        double        R[9], *M = T + 12 * j;
        figure_rotation(turn + 3 * j, R);
        for (r = 0; r < 3; r++) {           /* M = P R about h, which P carries */
            double at = P ? P[4 * r + 3] : h[r];
            for (c = 0; c < 3; c++) {
                M[4 * r + c] = P ? 0 : R[3 * r + c];
                for (k = 0; k < 3 && P; k++) M[4 * r + c] += P[4 * r + k] * R[3 * k + c];
                at += (P ? P[4 * r + c] * h[c] : 0) - M[4 * r + c] * h[c];
            }
            M[4 * r + 3] = at;
        }
    }
    figure_against(f, T);
}

/* The angles of figure_walk() at time t; 0: of files without a skeleton they are not known. */
static inline int figure_walk_angles(const figure *f, double t, double *turn) {
    double angle[SHAPES_BONES][3], shift[3], T[12 * 1000];
    int    j;
    if (!f->skin) {
        shapes_walk(t, 0, angle, shift);
        memcpy(turn, angle, sizeof angle);
        return 1;
    }
    if (!f->parent || f->back) return 0;
    figure_walk(f, t, T);
    for (j = 0; j < f->njoints; j++) figure_turn(T, f->parent[j], j, turn + 3 * j);
    return 1;
}

/* The joints at the angles `part` of the way from a to b. */
static inline void figure_between(const figure *f, const double *a, const double *b, double part,
                                  double *T) {
    double turn[3 * 1000];
    int    i;
    for (i = 0; i < 3 * f->njoints; i++) turn[i] = (1 - part) * a[i] + part * b[i];
    figure_at(f, turn, T);
}

/* Widens the ranges by the motion that was read last. */
static inline void figure_widen(figure *f) {
    double T[12 * 1000], v[3];
    int    i, j, c;
    for (i = f->lead; i < f->frames; i++) {
        figure_walk(f, i / 120.0, T);
        for (j = 0; j < f->njoints; j++) {
            figure_turn(T, f->parent[j], j, v);
            for (c = 0; c < 3; c++) {
                f->range[j][0][c] = fmin(f->range[j][0][c], v[c]);
                f->range[j][1][c] = fmax(f->range[j][1][c], v[c]);
            }
        }
    }
}

/* After a motion, which says how many joints there are. */
static inline const char *figure_read_skeleton(const char *path, figure *f) {
    char   line[256], name[40];
    double x[3], to[2];             /* from there a bone goes */
    int    j, p, n = 0, i;
    FILE  *in = fopen(path, "r");
    if (!in) return "the skeleton cannot be opened";
    f->arm[0] = f->arm[1] = -1;
    f->parent = (int *)malloc((size_t)f->njoints * sizeof(int));
    f->head = (double *)malloc((size_t)f->njoints * 3 * sizeof(double));
    f->range = (double(*)[2][3])malloc((size_t)f->njoints * sizeof *f->range);
    while (f->parent && f->head && f->range && n < f->njoints && fgets(line, sizeof line, in)) {
        const int told = sscanf(line, "%d %39s %d %lf %lf %lf %lf %lf", &j, name, &p, x, x + 1,
                                x + 2, to, to + 1);
        if (told < 6) continue;
        if (j != n || p < -1 || p >= j) break;
        for (i = 0; i < 2; i++)
            if (told == 8 && !strcmp(name, i ? "RightArm" : "LeftArm"))
                f->arm[i] = n, f->reach[i][0] = to[0] - x[0], f->reach[i][1] = to[1] - x[1];
        f->parent[n] = p, memcpy(f->head + 3 * n, x, sizeof x);
        for (i = 0; i < 3; i++) f->range[n][0][i] = HUGE_VAL, f->range[n][1][i] = -HUGE_VAL;
        n++;
    }
    fclose(in);
    return n == f->njoints ? NULL : "the skeleton does not fit the motion's joints";
}

/* Angles at random, `amount` of what a person can: by formula, arms, trunk, legs, 0: at rest; by a
 * skeleton about the middle of what the motions span, so that 0 is that middle. */
static inline void figure_angles(const figure *f, uint64_t seed, double amount, double *turn) {
    /* the largest turn of each bone, about x, y and z, radians, and the middle of its range */
    static const double most[SHAPES_BONES][3] = {
        {0.1, 0.2, 0.1}, {0.3, 0.4, 0.2}, {0.3, 0.4, 0.2}, {0.7, 0.4, 0.4}, {0.7, 0.4, 0.4},
        {0.5, 0.7, 0.0}, {0.5, 0.7, 0.0}, {0.7, 0.2, 0.2}, {0.7, 0.2, 0.2}, {0.6, 0.0, 0.0},
        {0.6, 0.0, 0.0}, {0.3, 0.1, 0.1}, {0.3, 0.1, 0.1}};
    static const double middle[SHAPES_BONES][3] = {
        {0, 0, 0}, {0.1, 0, 0}, {0, 0, 0}, {0, 0, -0.15}, {0, 0, 0.15}, {-0.5, 0, 0}, {-0.5, 0, 0},
        {-0.2, 0, 0}, {-0.2, 0, 0}, {0.6, 0, 0}, {0.6, 0, 0}, {0, 0, 0}, {0, 0, 0}};
    int i;
    for (i = 0; i < 3 * f->njoints; i++) {
        const double draw = figure_random(seed, i);
        if (f->parent) {
            const double lo = f->range[i / 3][0][i % 3], hi = f->range[i / 3][1][i % 3];
            turn[i] = 0.5 * (lo + hi) + 0.5 * amount * draw * (hi - lo);
        } else turn[i] = amount * (most[i / 3][i % 3] * draw + middle[i / 3][i % 3]);
    }
}

/* The angles that hold both upper arms straight out to their sides. */
static inline void figure_arms(const figure *f, double *turn) {
    int k;
    memset(turn, 0, 3 * (size_t)f->njoints * sizeof *turn);
    for (k = 0; k < 2; k++) {
        const double *r = f->reach[k];
        turn[3 * f->arm[k] + 2] = (r[0] > 0 ? -1 : 1) * atan2(r[1], fabs(r[0]));
    }
}

/* The rest is from now on that of these arms, as a paper's T-pose; after skeleton and motions. */
static inline const char *figure_arms_out(figure *f) {
    double turn[3 * 1000], *T;
    int    j, r, c;
    if (f->arm[0] < 0 || f->arm[1] < 0 || f->back) return "the body's arms are not known";
    T = (double *)malloc(12 * (size_t)f->njoints * sizeof(double));
    f->own_x = (double *)malloc(3 * (size_t)f->nv * sizeof(double));
    if (!T || !f->own_x) {
        free(T);
        return "out of memory";
    }
    figure_arms(f, turn);
    figure_at(f, turn, T);
    figure_skin(f, T, f->own_x);
    for (j = 0; j < f->njoints; j++) {      /* [R | t] turned round: [R' | -R' t] */
        double M[12];
        for (r = 0; r < 3; r++) {
            for (c = 0; c < 3; c++) M[4 * r + c] = T[12 * j + 4 * c + r];
            for (M[4 * r + 3] = 0, c = 0; c < 3; c++)
                M[4 * r + 3] -= T[12 * j + 4 * c + r] * T[12 * j + 4 * c + 3];
        }
        memcpy(T + 12 * j, M, sizeof M);
    }
    f->x = f->own_x, f->back = T;
    return NULL;
}

static inline void figure_pose(const figure *f, uint64_t seed, double amount, double *T) {
    double turn[3 * 1000];
    figure_angles(f, seed, amount, turn);
    figure_at(f, turn, T);
}

#endif
