/* skeleton.h - bodies with bones that seeded random motions or poses of others drive, and how much
 * cloth is in them.
 *   skeleton k;  skeleton_formula(&k, 0.04);  skeleton_motion m = skeleton_random(&k, seed);
 *   skeleton_pose(&k, &m, t, x);  ...  skeleton_free(&k);
 * Include after clothsim.h, test.h and examples/shapes.h, in one .c file per program.
 *
 * Joints turn about axes through their heads at rest, y up, z forward, x to the body's left: a
 * joint's turn is a rotation vector in the frame of the body at rest, carried by its parents.
 * Random motions drive both upper arms, forearms, thighs and shins, and the trunk. */
#ifndef CLOTH_TEST_SKELETON_H
#define CLOTH_TEST_SKELETON_H

#include <stdint.h>

#define SKELETON_JOINTS 192
#define SKELETON_DRIVEN 9
#define SKELETON_KEYS   12

typedef struct skeleton {
    int     nv, nf, joints, nw;
    double *x;                              /* [nv x 3] at rest                                */
    int    *faces;                          /* [nf x 3]                                        */
    int    *vertex, *joint;                 /* [nw]                                            */
    double *weight;                         /* [nw]                                            */
    int     parent[SKELETON_JOINTS];        /* before its children; -1: none                   */
    double  head[SKELETON_JOINTS][3];
    char    name[SKELETON_JOINTS][32];
    int     driven[SKELETON_DRIVEN];        /* joint, in the order of skeleton_limits          */
} skeleton;

typedef struct skeleton_motion {            /* turns at the keys, rad; key 0 is rest           */
    double turn[SKELETON_KEYS][SKELETON_JOINTS][3];
    double key;                             /* s from key to key; 0: 0.5                       */
    int    frames;                          /* captured, if above 0: 120 a second, of each     */
    float *captured;                        /* joint where it takes the body, [3 x 4]          */
} skeleton_motion;

enum { SKELETON_LEFT_ARM, SKELETON_RIGHT_ARM, SKELETON_LEFT_FOREARM, SKELETON_RIGHT_FOREARM,
       SKELETON_LEFT_THIGH, SKELETON_RIGHT_THIGH, SKELETON_LEFT_SHIN, SKELETON_RIGHT_SHIN,
       SKELETON_TRUNK };

/* Least and most turn about x, y, z of the left side, rad; the right side mirrors y and z. From an
 * A-pose: arms sink into the side of the chest and reach up, elbows fold, a thigh comes up to the
 * belly and goes past the other one. */
static const double skeleton_limits[SKELETON_DRIVEN][3][2] = {
    {{-1.2, 0.6}, {-0.6, 0.6}, {-0.85, 0.5}}, {{-1.2, 0.6}, {-0.6, 0.6}, {-0.85, 0.5}},
    {{-1.9, 0}, {-1.2, 0}, {0, 0}},           {{-1.9, 0}, {-1.2, 0}, {0, 0}},
    {{-1.4, 0.4}, {-0.2, 0.2}, {-0.25, 0.3}}, {{-1.4, 0.4}, {-0.2, 0.2}, {-0.25, 0.3}},
    {{0, 1.9}, {0, 0}, {0, 0}},               {{0, 1.9}, {0, 0}, {0, 0}},
    {{-0.2, 0.5}, {-0.3, 0.3}, {-0.15, 0.15}}};

static inline void skeleton_free(skeleton *k) {
    free(k->x);
    free(k->faces);
    free(k->vertex);
    free(k->joint);
    free(k->weight);
    memset(k, 0, sizeof *k);
}

static inline void skeleton_room(skeleton *k, int nv, int nf, int most) {
    k->nv = nv, k->nf = nf;
    k->x = (double *)malloc(3 * (size_t)nv * sizeof(double));
    k->faces = (int *)malloc(3 * (size_t)nf * sizeof(int));
    k->vertex = (int *)malloc((size_t)most * sizeof(int));
    k->joint = (int *)malloc((size_t)most * sizeof(int));
    k->weight = (double *)malloc((size_t)most * sizeof(double));
    if (!k->x || !k->faces || !k->vertex || !k->joint || !k->weight) exit(2);
}

/* The body of the examples with edges of `edge` m. */
static inline int skeleton_formula(skeleton *k, double edge) {
    static const int driven[SKELETON_DRIVEN] = {3, 4, 5, 6, 7, 8, 9, 10, 1};
    shapes_body      b;
    int              i, j;
    memset(k, 0, sizeof *k);
    if (shapes_body_make(edge, &b)) return 0;
    skeleton_room(k, b.nv, b.nf, 4 * b.nv);
    memcpy(k->x, b.x, 3 * (size_t)b.nv * sizeof(double));
    memcpy(k->faces, b.faces, 3 * (size_t)b.nf * sizeof(int));
    for (i = 0; i < 4 * b.nv; i++) {
        if (!(b.weight[i] > 0)) continue;
        k->vertex[k->nw] = i / 4;
        k->joint[k->nw] = b.bone[i];
        k->weight[k->nw++] = b.weight[i];
    }
    k->joints = SHAPES_BONES;
    for (j = 0; j < SHAPES_BONES; j++) {
        k->parent[j] = shapes_parent[j];
        memcpy(k->head[j], shapes_joint[j], sizeof k->head[j]);
    }
    memcpy(k->driven, driven, sizeof driven);
    shapes_body_free(&b);
    return 1;
}

static inline int skeleton_read(skeleton *k, FILE *joints, FILE *weights, int most) {
    static const char *const name[SKELETON_DRIVEN] = {
        "LeftArm", "RightArm", "LeftForeArm", "RightForeArm", "LeftUpLeg", "RightUpLeg", "LeftLeg",
        "RightLeg", "LowerBack"};
    char line[256], word[32];
    int  i, at, parent, found = 0;
    while (fgets(line, sizeof line, joints)) {
        double h[3];
        if (sscanf(line, "%d %31s %d %lf %lf %lf", &at, word, &parent, h, h + 1, h + 2) != 6)
            continue;
        if (at != k->joints || at >= SKELETON_JOINTS || parent >= at) return 0;
        k->parent[at] = parent;
        memcpy(k->head[at], h, sizeof h);
        memcpy(k->name[at], word, sizeof word);
        k->joints++;
        for (i = 0; i < SKELETON_DRIVEN; i++)
            if (!strcmp(word, name[i])) k->driven[i] = at, found++;
    }
    while (k->nw < most && fgets(line, sizeof line, weights))
        k->nw += sscanf(line, "%d %d %lf", k->vertex + k->nw, k->joint + k->nw,
                        k->weight + k->nw) == 3;
    for (i = 0; i < k->nw; i++)
        if (k->vertex[i] < 0 || k->vertex[i] >= k->nv || k->joint[i] < 0 ||
            k->joint[i] >= k->joints)
            return 0;
    return (found == SKELETON_DRIVEN || !found) && k->nw > 0;
}

/* A body of the shared data, "body" or "body_m", with its rig "cmu", that random motions know, or
 * "default", that poses are of; 0 when it is not there. */
static inline int skeleton_shared(skeleton *k, const char *folder, const char *rig) {
    const int   most = 65536;
    cloth_mesh *mesh = NULL;
    FILE       *joints, *weights;
    char        path[128];
    int         ok;
    memset(k, 0, sizeof *k);
    (void)sprintf(path, "data/%.32s/body.obj", folder);
    if (cloth_obj_load(NULL, test_shared(path), NULL, &mesh) != CLOTH_OK) return 0;
    skeleton_room(k, mesh->nv, mesh->nf, most);
    memcpy(k->x, mesh->x, 3 * (size_t)mesh->nv * sizeof(double));
    memcpy(k->faces, mesh->faces, 3 * (size_t)mesh->nf * sizeof(int));
    cloth_mesh_destroy(NULL, mesh);
    (void)sprintf(path, "data/%.32s/skeleton_%.32s.txt", folder, rig);
    joints = fopen(test_shared(path), "r");
    (void)sprintf(path, "data/%.32s/weights_%.32s.txt", folder, rig);
    weights = fopen(test_shared(path), "r");
    ok = joints && weights && skeleton_read(k, joints, weights, most);
    if (joints) fclose(joints);
    if (weights) fclose(weights);
    if (!ok) skeleton_free(k);
    return ok;
}

/* --- motion --- */

/* A number in [0, 1) from a counter (splitmix64). */
static inline double skeleton_number(uint64_t *state) {
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (double)(z >> 11) / 9007199254740992.0;
}

static inline skeleton_motion skeleton_random(const skeleton *k, unsigned seed) {
    skeleton_motion m;
    uint64_t        state = (uint64_t)seed * 0x632be59bd9b4e019u + 7;
    int             i, j, a;
    memset(&m, 0, sizeof m);
    for (i = 1; i < SKELETON_KEYS; i++)
        for (j = 0; j < SKELETON_DRIVEN; j++)
            for (a = 0; a < 3; a++) {
                const double *l = skeleton_limits[j][a], u = skeleton_number(&state);
                const double  mirror = a && (j % 2) && j < SKELETON_TRUNK ? -1 : 1;
                m.turn[i][k->driven[j]][a] = mirror * (l[0] + u * (l[1] - l[0]));
            }
    return m;
}

/* R = exp of the rotation vector w (Rodrigues 1840). */
static inline void skeleton_turn(const double *w, double R[9]) {
    const double a = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    const double s = a > 1e-12 ? sin(a) / a : 1, c = a > 1e-12 ? (1 - cos(a)) / (a * a) : 0.5;
    int          i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) R[3 * i + j] = c * w[i] * w[j] + (i == j ? cos(a) : 0);
    R[1] -= s * w[2], R[3] += s * w[2];
    R[2] += s * w[1], R[6] -= s * w[1];
    R[5] -= s * w[0], R[7] += s * w[0];
}

static inline void skeleton_times(const double A[9], const double B[9], double C[9]) {
    int i, b;
    for (i = 0; i < 9; i++)
        for (C[i] = 0, b = 0; b < 3; b++) C[i] += A[i / 3 * 3 + b] * B[3 * b + i % 3];
}

/* The rotation vector of R, less than half a turn. */
static inline void skeleton_untwist(const double R[9], double *w) {
    double s, a;
    w[0] = R[7] - R[5], w[1] = R[2] - R[6], w[2] = R[3] - R[1];
    s = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    a = atan2(s, R[0] + R[4] + R[8] - 1);
    w[0] *= s > 1e-9 ? a / s : 0.5, w[1] *= s > 1e-9 ? a / s : 0.5, w[2] *= s > 1e-9 ? a / s : 0.5;
}

/* Turns of the joints in the first frame of a BVH file, of joints by their names, z up in it:
 * R = R1 R2 R3 of the channels in their order. 0: not there, or no joint of it is known. */
static inline int skeleton_bvh(const skeleton *k, const char *path, double turn[][3]) {
    static int joint[8 * SKELETON_JOINTS], axis[8 * SKELETON_JOINTS];   /* of a channel; -1: none */
    double     R[SKELETON_JOINTS][9], own[9], was[9], w[3], number;
    char       word[64];
    FILE      *f = fopen(path, "r");
    int        n = 0, at = -1, known = 0, j, c;
    if (!f) return 0;
    while (fscanf(f, "%63s", word) == 1 && strcmp(word, "MOTION")) {
        int left = 0;
        if (!strcmp(word, "ROOT") || !strcmp(word, "JOINT")) {
            if (fscanf(f, "%63s", word) != 1) break;
            for (at = k->joints - 1; at >= 0 && strcmp(word, k->name[at]); at--) {}
            known += at >= 0;
        }
        if (!strcmp(word, "CHANNELS") && fscanf(f, "%d", &left) != 1) break;
        for (; left-- > 0 && n < 8 * SKELETON_JOINTS && fscanf(f, "%63s", word) == 1; n++)
            joint[n] = at, axis[n] = strcmp(word + 1, "rotation") ? -1 : word[0] - 'X';
    }
    for (j = 0; j < k->joints; j++)
        for (c = 0; c < 9; c++) R[j][c] = c % 4 == 0;
    if (fscanf(f, " Frames: %d Frame Time: %lf", &c, &number) != 2) n = known = 0;
    for (c = 0; c < n && fscanf(f, "%lf", &number) == 1; c++) {
        if (joint[c] < 0 || axis[c] < 0 || axis[c] > 2) continue;
        memset(w, 0, sizeof w);
        w[axis[c]] = number * 3.14159265358979 / 180;
        skeleton_turn(w, own);
        memcpy(was, R[joint[c]], sizeof was);
        skeleton_times(was, own, R[joint[c]]);
    }
    for (j = 0; j < k->joints; j++) {       /* x, y, z there are x, -z, y here */
        skeleton_untwist(R[j], w);
        turn[j][0] = w[0], turn[j][1] = w[2], turn[j][2] = -w[1];
    }
    fclose(f);
    return known > 0 && c == n;
}

/* A captured motion (.skin of ../shared) for this rig; m->captured is the caller's to free. */
static inline int skeleton_skin(const skeleton *k, const char *path, skeleton_motion *m) {
    FILE   *f = fopen(path, "rb");
    char    word[8];
    int32_t head[4];
    size_t  n = 0;
    memset(m, 0, sizeof *m);
    if (!f) return 0;
    if (fread(word, 1, 8, f) == 8 && !memcmp(word, "SKINMAT1", 8) && fread(head, 4, 4, f) == 4 &&
        head[0] > 1 && head[1] == k->joints && head[2] == 120) {
        n = 12 * (size_t)head[0] * (size_t)head[1];
        m->captured = (float *)malloc(n * sizeof *m->captured);
        if (!m->captured) exit(2);
        m->frames = head[0];
    }
    if (n && fread(m->captured, sizeof *m->captured, n, f) != n) n = 0;
    fclose(f);
    return n > 0;
}

/* Joint j of a captured motion at t s: its turn, and where its head is. */
static inline void skeleton_frame(const skeleton *k, const skeleton_motion *m, double t, int j,
                                  double *R, double *at) {
    const double at120 = fmin(120 * t, m->frames - 1.001), u = at120 - floor(at120);
    const float *p = m->captured + 12 * ((size_t)at120 * (size_t)k->joints + (size_t)j);
    const float *q = p + 12 * k->joints;
    int          a, b;
    for (a = 0; a < 3; a++) {
        double M[4];
        for (b = 0; b < 4; b++) M[b] = (1 - u) * (double)p[4 * a + b] + u * (double)q[4 * a + b];
        for (at[a] = M[3], b = 0; b < 3; b++) {
            R[3 * a + b] = M[b];
            at[a] += M[b] * k->head[j][b];
        }
    }
}

/* x [nv x 3] at t s; between the keys the turns go by u^2 (3 - 2 u). Blended linearly. */
static inline void skeleton_pose(const skeleton *k, const skeleton_motion *m, double t, double *x) {
    double       R[SKELETON_JOINTS][9], at[SKELETON_JOINTS][3];
    const double keys = t / (m->key > 0 ? m->key : 0.5);
    const int    key = keys < SKELETON_KEYS - 2 ? (int)keys : SKELETON_KEYS - 2;
    double       u = fmin(1, keys - key);
    int          i, j, a, b;
    u = u * u * (3 - 2 * u);
    for (j = 0; j < k->joints && m->captured; j++) skeleton_frame(k, m, t, j, R[j], at[j]);
    for (j = 0; j < k->joints && !m->captured; j++) {       /* where the head goes, and its turn */
        const int p = k->parent[j];
        double    own[9], w[3];
        for (a = 0; a < 3; a++) w[a] = (1 - u) * m->turn[key][j][a] + u * m->turn[key + 1][j][a];
        skeleton_turn(w, own);
        if (p < 0) memcpy(R[j], own, sizeof own);
        else skeleton_times(R[p], own, R[j]);
        for (a = 0; a < 3; a++)
            for (at[j][a] = p < 0 ? k->head[j][a] : at[p][a], b = 0; p >= 0 && b < 3; b++)
                at[j][a] += R[p][3 * a + b] * (k->head[j][b] - k->head[p][b]);
    }
    memset(x, 0, 3 * (size_t)k->nv * sizeof(double));
    for (i = 0; i < k->nw; i++) {
        const double *rest = k->x + 3 * k->vertex[i];
        j = k->joint[i];
        for (a = 0; a < 3; a++) {
            double to = at[j][a];
            for (b = 0; b < 3; b++) to += R[j][3 * a + b] * (rest[b] - k->head[j][b]);
            x[3 * k->vertex[i] + a] += k->weight[i] * to;
        }
    }
}

/* --- what is in the body --- */

/* Solid angle of the triangle abc seen from p over 4 pi (Van Oosterom and Strackee 1983). */
static inline double skeleton_angle(const double *a, const double *b, const double *c,
                                    const double *p) {
    double       u[3], v[3], w[3], uu = 0, vv = 0, ww = 0, uv = 0, vw = 0, wu = 0, det;
    int          i;
    for (i = 0; i < 3; i++) {
        u[i] = a[i] - p[i], v[i] = b[i] - p[i], w[i] = c[i] - p[i];
        uu += u[i] * u[i], vv += v[i] * v[i], ww += w[i] * w[i];
        uv += u[i] * v[i], vw += v[i] * w[i], wu += w[i] * u[i];
    }
    uu = sqrt(uu), vv = sqrt(vv), ww = sqrt(ww);
    det = u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2])
          + u[2] * (v[0] * w[1] - v[1] * w[0]);
    return atan2(det, uu * vv * ww + uv * ww + vw * uu + wu * vv) / 6.283185307179586477;
}

/* Distance of p from the triangle abc, m: from its plane within its sides, else from the sides. */
static inline double skeleton_distance(const double *a, const double *b, const double *c,
                                       const double *p) {
    const double *v[3];
    double        n[3], len = 0, above = 0, best = HUGE_VAL;
    int           i, k, outside = 0;
    v[0] = a, v[1] = b, v[2] = c;
    for (k = 0; k < 3; k++) {
        const int y = (k + 1) % 3, z = (k + 2) % 3;
        n[k] = (b[y] - a[y]) * (c[z] - a[z]) - (b[z] - a[z]) * (c[y] - a[y]);
        len += n[k] * n[k];
        above += n[k] * (p[k] - a[k]);
    }
    for (i = 0; i < 3; i++) {
        const double *o = v[i], *q = v[(i + 1) % 3];
        double        side = 0, t = 0, ee = 0, d = 0;
        for (k = 0; k < 3; k++) {
            const int y = (k + 1) % 3, z = (k + 2) % 3;
            side += n[k] * ((q[y] - o[y]) * (p[z] - o[z]) - (q[z] - o[z]) * (p[y] - o[y]));
            t += (q[k] - o[k]) * (p[k] - o[k]);
            ee += (q[k] - o[k]) * (q[k] - o[k]);
        }
        outside |= side < 0;
        t = ee > 0 ? fmax(0, fmin(1, t / ee)) : 0;
        for (k = 0; k < 3; k++) {
            const double r = p[k] - o[k] - t * (q[k] - o[k]);
            d += r * r;
        }
        best = fmin(best, d);
    }
    return !outside && len > 0 ? fabs(above) / sqrt(len) : sqrt(best);
}

/* Percent of the vertices p [n x 3], every `stride`-th, that are swallowed: winding number of the
 * body at x in (0.5, 1.5), that is in the body but not where it overlaps itself, and deeper than
 * 3 mm. *deep: m, of the deepest. */
static inline double skeleton_swallowed(const skeleton *k, const double *x, const double *p, int n,
                                        int stride, double *deep) {
    int i, f, in = 0, all = 0;
    for (i = 0; i < n; i += stride, all++) {
        double wind = 0, d = HUGE_VAL;
        for (f = 0; f < k->nf; f++) {
            const int *t = k->faces + 3 * f;
            wind += skeleton_angle(x + 3 * t[0], x + 3 * t[1], x + 3 * t[2], p + 3 * i);
        }
        if (!(wind > 0.5 && wind < 1.5)) continue;
        for (f = 0; f < k->nf; f++) {
            const int *t = k->faces + 3 * f;
            d = fmin(d, skeleton_distance(x + 3 * t[0], x + 3 * t[1], x + 3 * t[2], p + 3 * i));
        }
        in += d > 3e-3;
        *deep = fmax(*deep, d);
    }
    return all ? 100.0 * in / all : 0;
}

#endif
