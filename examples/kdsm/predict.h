/* predict.h - a network that says where a garment hangs when the joints are so; and it as a file.
 * SPDX-License-Identifier: MIT
 *
 *     static wearer    w;                             who wears it: a body, the space round it
 *     static predictor p;                             what 03_learn.c learned and wrote
 *     const char      *error = predictor_read("out/predictor", &p);
 *     if (!error) error = wearer_make(&f, p.nv, p.u, nf, faces, &w);
 *     if (!error) error = predictor_fits(&p, &w);
 *     if (!error) error = predict(&w, &p, T, before, x);  the garment [nv x 3] under the joints T,
 *                                                     which were `before` 1/60 s earlier
 *     wearer_free(&w), predictor_free(&p);
 *
 * Three sets of numbers for a garment in a pose, each [nv x 3]; the network learns one of them:
 *   PREDICT_SPACE   d of the hybrid [6.2 of kdsm.h], put back by kdsm_place()
 *   PREDICT_FRAMES  offsets from points of the body's surface in frames that turn with it: exact
 *   PREDICT_UVN     d of method 2: the nearest point of the body, and how far along its normal,
 *                   both taken to the body at rest; put back by kdsm_carry(). Not exact
 *
 * Two networks: one says where the garment hangs when the joints are held still; the other what
 * their motion adds, times g = s/(1 + s), s the sum of the squared rates over their deviation: 0
 * where nothing moves.
 *
 * The file: KDSMNET2; uint32 kind, joints, vertices of garment and of body, faces of the garment,
 * four sizes of the first network (the second has twice the inputs); uint64 of body and garment
 * (what they are made of, hashed); doubles: u [3 nv], mean and deviation of each input and of each
 * output, the parameters of both; uint64, the hash of all before. Little-endian machines.
 * checked: tests/test_kdsm.c: predictor_comes_back, predictor_refuses
 */
#ifndef KDSM_EXAMPLE_PREDICT_H
#define KDSM_EXAMPLE_PREDICT_H

#include "figure.h"
#include "net.h"
#include <stdint.h>
#include <stdio.h>

enum { PREDICT_SPACE, PREDICT_FRAMES, PREDICT_UVN, PREDICT_KINDS };
#define PREDICT_OWN PREDICT_KINDS               /* other numbers, of a program's own */

#define PREDICT_HASH 14695981039346656037u      /* the start of FNV-1a, 64 bits             */
#define PREDICT_HEAD 9
#define PREDICT_STEP (1.0 / 60)                 /* s, from `before` to now                  */

typedef struct skin_point {     /* of a vertex of cloth: a face of the body, where on it    */
    int    face;
    double w[3];
} skin_point;

typedef struct skin_frame {     /* of an anchor in a pose: a point and three unit vectors   */
    double q[3], t[3], b[3], n[3];
} skin_frame;

typedef struct wearer {
    const figure *f;            /* borrowed                                                 */
    kdsm_space   *space;
    kdsm_pose    *rest, *pose;
    kdsm_cloth   *cloth;
    skin_point   *anchors;      /* [nv]                                                     */
    double       *body, *normal;        /* [f->nv x 3]                                      */
    double       *T;            /* [joints x 12] of `pose`; 0 at first, which is no pose    */
    uint64_t      id;           /* of body and garment                                      */
} wearer;

typedef struct predictor {
    int      kind, njoints, nv, nf, body;       /* of the garment; the body's vertices      */
    uint64_t id;
    net      still, swing;      /* of the turns; of the turns and their rates               */
    double  *u;                 /* [nv x 3] the garment at rest                             */
    double  *mean[2], *over[2]; /* of each turn and rate (that is 0), of each output        */
    char     said[200];         /* what is wrong with a file                                */
} predictor;

static inline uint64_t predict_hash(uint64_t h, const void *data, size_t n) {
    const unsigned char *p = (const unsigned char *)data;
    size_t               i;
    for (i = 0; i < n; i++) h = (h ^ p[i]) * 1099511628211u;
    return h;
}

/* ----- who wears it ------------------------------------------------------------------- */

static inline void wearer_free(wearer *w) {
    kdsm_cloth_destroy(w->cloth), kdsm_pose_destroy(w->pose), kdsm_pose_destroy(w->rest);
    kdsm_destroy(w->space);
    free(w->anchors), free(w->body), free(w->T);
    memset(w, 0, sizeof *w);
}

/* The nearest point of the body at rest for every vertex of the garment. */
static inline void wearer_anchor(wearer *w) {
    const figure *f = w->f;
    int           i, k;
    for (i = 0; i < w->cloth->nv; i++) {
        const double *u = w->cloth->u + 3 * (size_t)i;
        double        best = HUGE_VAL, a[3];
        for (k = 0; k < f->nf; k++) {
            const int   *v = f->faces + 3 * (size_t)k;
            const double d = kdsmi_triangle2(u, f->x + 3 * (size_t)v[0], f->x + 3 * (size_t)v[1],
                                             f->x + 3 * (size_t)v[2], a);
            if (!(d < best)) continue;
            best = d, w->anchors[i].face = k;
            memcpy(w->anchors[i].w, a, sizeof a);
        }
    }
}

/* u [nv x 3]: the garment as it hangs at rest. */
static inline const char *wearer_make(const figure *f, int nv, const double *u, int nf,
                                      const int *faces, wearer *w) {
    kdsm_desc    desc = kdsm_desc_default();
    const size_t nb = 3 * (size_t)f->nv, nw = (size_t)f->nv * (size_t)f->influences;
    memset(w, 0, sizeof *w);
    w->f = f;
    figure_body(f, &desc);
    desc.hooks.log.fn = cloth_log_stderr, desc.thickness = 0.1;
    if (kdsm_create(&desc, &w->space) || kdsm_pose_create(w->space, &w->pose)
        || kdsm_pose_create(w->space, &w->rest)) return "the body has no space round it";
    if (kdsm_cloth_create(w->space, nv, u, nf, faces, &w->cloth))
        return "the garment cannot be embedded";
    w->anchors = (skin_point *)calloc((size_t)nv, sizeof *w->anchors);
    w->body = (double *)calloc(nb, 2 * sizeof(double));
    w->T = (double *)calloc((size_t)f->njoints, 12 * sizeof(double));
    if (!w->anchors || !w->body || !w->T) return "out of memory";
    w->normal = w->body + nb;
    w->id = predict_hash(PREDICT_HASH, f->x, nb * sizeof(double));
    w->id = predict_hash(w->id, f->faces, 3 * (size_t)f->nf * sizeof(int));
    w->id = predict_hash(w->id, f->joint, nw * sizeof(int));
    w->id = predict_hash(w->id, f->weight, nw * sizeof(double));
    w->id = predict_hash(w->id, faces, 3 * (size_t)nf * sizeof(int));
    wearer_anchor(w);
    return NULL;
}

/* ----- numbers for a garment in a pose, and back -------------------------------------- */

/* The frame of an anchor: normal of the surface, tangent along the first edge of its face. */
static inline void wearer_frame(const wearer *w, const skin_point *a, skin_frame *out) {
    const int    *v = w->f->faces + 3 * (size_t)a->face;
    const double *x = w->body;
    double        l, d;
    int           k, c;
    memset(out, 0, sizeof *out);
    for (k = 0; k < 3; k++)
        for (c = 0; c < 3; c++) {
            out->q[c] += a->w[k] * x[3 * v[k] + c];
            out->n[c] += a->w[k] * w->normal[3 * v[k] + c];
        }
    l = sqrt(kdsmi_dot(out->n, out->n));
    for (c = 0; c < 3; c++) {
        out->n[c] /= l > 0 ? l : 1;
        out->t[c] = x[3 * v[1] + c] - x[3 * v[0] + c];
    }
    d = kdsmi_dot(out->t, out->n);
    for (c = 0; c < 3; c++) out->t[c] -= d * out->n[c];
    l = sqrt(kdsmi_dot(out->t, out->t));
    for (c = 0; c < 3; c++) out->t[c] /= l > 0 ? l : 1;
    kdsmi_cross(out->n, out->t, out->b);
}

/* Offsets of x [nv x 3] from the anchors under T, or x from offsets; in place. */
static inline void wearer_offsets(wearer *w, const double *T, double *x, int back) {
    int i, c;
    figure_skin(w->f, T, w->body);
    kdsmi_normals(w->f->nv, w->body, w->f->nf, w->f->faces, w->normal);
    for (i = 0; i < w->cloth->nv; i++) {
        skin_frame a;
        double e[3], was[3], *at = x + 3 * (size_t)i;
        memcpy(was, at, sizeof was);
        wearer_frame(w, w->anchors + i, &a);
        for (c = 0; c < 3 && back; c++)
            at[c] = a.q[c] + was[0] * a.t[c] + was[1] * a.b[c] + was[2] * a.n[c];
        if (back) continue;
        kdsmi_sub(was, a.q, e);
        at[0] = kdsmi_dot(e, a.t), at[1] = kdsmi_dot(e, a.b), at[2] = kdsmi_dot(e, a.n);
    }
}

/* The space in the pose T, where it is not in it yet. */
static inline const char *wearer_pose(wearer *w, const double *T) {
    const size_t n = 12 * (size_t)w->space->njoints * sizeof *T;
    if (memcmp(w->T, T, n) == 0) return NULL;
    if (kdsm_pose_set(w->pose, T)) return "the space cannot be posed";
    memcpy(w->T, T, n);
    return NULL;
}

/* The numbers of kind [nv x 3] for the garment x [nv x 3] under the joints T. */
static inline const char *wearer_take(wearer *w, int kind, const double *T, const double *x,
                                      double *numbers, kdsm_displace_report *report) {
    kdsm_options o = kdsm_options_default();
    const char  *error = kind == PREDICT_FRAMES ? NULL : wearer_pose(w, T);
    if (error) return error;
    if (kind == PREDICT_FRAMES) {
        memcpy(numbers, x, 3 * (size_t)w->cloth->nv * sizeof *x);
        wearer_offsets(w, T, numbers, 0);
        return NULL;
    }
    o.method = kind == PREDICT_UVN ? KDSM_SURFACE : KDSM_HYBRID;
    return kdsm_displace(w->cloth, w->pose, x, &o, numbers, NULL, report) ? "no displacement"
                                                                          : NULL;
}

/* The garment from its numbers, in place. */
static inline const char *wearer_put(wearer *w, int kind, const double *T, double *x) {
    const int   nv = w->cloth->nv;
    const char *error;
    int         i;
    if (kind == PREDICT_SPACE)
        return kdsm_place(w->cloth, T, x, x, NULL) ? "the garment cannot be placed" : NULL;
    if (kind == PREDICT_FRAMES) wearer_offsets(w, T, x, 1);
    if (kind == PREDICT_FRAMES || kind == PREDICT_OWN) return NULL;
    for (i = 0; i < 3 * nv; i++) x[i] += w->cloth->u[i];
    error = wearer_pose(w, T);
    if (error) return error;
    return kdsm_carry(w->rest, w->pose, nv, x, x) ? "the garment cannot be carried" : NULL;
}

/* ----- the network's word ------------------------------------------------------------- */

/* in [2 x njoints x 3]: how R_0 turns, then R_0' R_j; then how far each would turn at its present
 * rate in 0.1 s: how fast a body moves is what swings a garment. */
static inline void predict_inputs(const double *T, const double *before, int njoints, double *in) {
    double *rate = in + 3 * njoints;
    int     j, c;
    for (j = 0; j < njoints; j++) {
        figure_turn(T, j ? 0 : -1, j, in + 3 * j);
        figure_between_frames(before + 12 * j, T + 12 * j, rate + 3 * j);
        for (c = 0; c < 3; c++) rate[3 * j + c] *= 0.1 / PREDICT_STEP;
    }
}

/* Inputs over their spread, in place; g. */
static inline double predictor_scale(const predictor *p, double *in) {
    double s = 0;
    int    i;
    for (i = 0; i < p->swing.n[0]; i++) {
        in[i] = (in[i] - p->mean[0][i]) / p->over[0][i];
        if (i >= p->still.n[0]) s += in[i] * in[i];
    }
    return s / (1 + s);
}

/* The outputs [nv x 3] of scaled inputs; by the first network alone where g is 0. */
static inline void predictor_say(predictor *p, double g, const double *in, double *out) {
    const double *still = net_forward(&p->still, in);
    const double *swing = g > 0 ? net_forward(&p->swing, in) : NULL;
    int           i;
    for (i = 0; i < 3 * p->nv; i++)
        out[i] = p->mean[1][i] + p->over[1][i] * (still[i] + (swing ? g * swing[i] : 0));
}

/* x [nv x 3]: the garment under the joints T, which were `before` 1/60 s earlier; T: held still. */
static inline const char *predict(wearer *w, predictor *p, const double *T, const double *before,
                                  double *x) {
    double *in = p->swing.e[0];             /* free while nothing is learned */
    predict_inputs(T, before, p->njoints, in);
    predictor_say(p, predictor_scale(p, in), in, x);
    return wearer_put(w, p->kind, T, x);
}

/* ----- the file ----------------------------------------------------------------------- */

static inline void predictor_free(predictor *p) {
    net_free(&p->still), net_free(&p->swing);
    free(p->u);
    memset(p, 0, sizeof *p);
}

/* Room for n and what the networks begin with; 1, or 0 without memory. */
static inline int predictor_room(const int n[NET_LAYERS + 1], uint64_t seed, predictor *p) {
    const int    m[NET_LAYERS + 1] = {2 * n[0], n[1], n[2], n[3]};
    const size_t in = 2 * (size_t)n[0], out = (size_t)n[NET_LAYERS];
    p->u = (double *)calloc(3 * out + 2 * in, sizeof(double));
    if (!p->u || !net_make(n, seed, &p->still) || !net_make(m, seed + 1, &p->swing)) return 0;
    p->mean[0] = p->u + out, p->over[0] = p->mean[0] + in;
    p->mean[1] = p->over[0] + in, p->over[1] = p->mean[1] + out;
    return 1;
}

/* One that knows nothing yet; 1, or 0 without memory. */
static inline int predictor_make(const wearer *w, int kind, int hidden, uint64_t seed,
                                 predictor *p) {
    const int n[NET_LAYERS + 1] = {3 * w->space->njoints, hidden, hidden, 3 * w->cloth->nv};
    memset(p, 0, sizeof *p);
    p->kind = kind, p->njoints = w->space->njoints, p->nv = w->cloth->nv, p->nf = w->cloth->nf;
    p->body = w->f->nv, p->id = w->id;
    if (!predictor_room(n, seed, p)) {
        predictor_free(p);
        return 0;
    }
    memcpy(p->u, w->cloth->u, (size_t)n[NET_LAYERS] * sizeof(double));
    return 1;
}

/* NULL, or which name, number or thing of the predictor is not the wearer's. */
static inline const char *predictor_fits(predictor *p, const wearer *w) {
    const char *const name[4] = {"joints", "vertices of the garment", "faces of the garment",
                                 "vertices of the body"};
    const int         is[4] = {p->njoints, p->nv, p->nf, p->body};
    const int         want[4] = {w->space->njoints, w->cloth->nv, w->cloth->nf, w->f->nv};
    int               i;
    for (i = 0; i < 4; i++) {
        if (is[i] == want[i]) continue;
        sprintf(p->said, "the predictor's %s: %d, here %d", name[i], is[i], want[i]);
        return p->said;
    }
    if (p->id == w->id && !memcmp(p->u, w->cloth->u, 3 * (size_t)p->nv * sizeof(double)))
        return NULL;
    sprintf(p->said, "the predictor's body and garment (%08lx) are of this size, but others: %08lx",
            (unsigned long)(p->id & 0xffffffffu), (unsigned long)(w->id & 0xffffffffu));
    return p->said;
}

/* NULL or what is wrong. */
static inline const char *predictor_write(const char *path, const predictor *p) {
    const int     *n = p->still.n;
    const uint32_t head[PREDICT_HEAD] = {(uint32_t)p->kind, (uint32_t)p->njoints, (uint32_t)p->nv,
                                         (uint32_t)p->body, (uint32_t)p->nf, (uint32_t)n[0],
                                         (uint32_t)n[1], (uint32_t)n[2], (uint32_t)n[3]};
    const size_t   lead = (size_t)(3 * n[NET_LAYERS] + 4 * n[0]), np = p->still.at[NET_LAYERS];
    const size_t   nq = p->swing.at[NET_LAYERS];
    uint64_t       h = predict_hash(PREDICT_HASH, "KDSMNET2", 8);
    FILE          *f = fopen(path, "wb");
    int            ok;
    if (!f) return "the predictor's file cannot be written";
    h = predict_hash(h, head, sizeof head), h = predict_hash(h, &p->id, sizeof p->id);
    h = predict_hash(h, p->u, lead * sizeof(double));
    h = predict_hash(h, p->still.p, np * sizeof(double));
    h = predict_hash(h, p->swing.p, nq * sizeof(double));
    ok = fwrite("KDSMNET2", 1, 8, f) == 8 && fwrite(head, sizeof head, 1, f) == 1
         && fwrite(&p->id, sizeof p->id, 1, f) == 1 && fwrite(p->u, sizeof(double), lead, f) == lead
         && fwrite(p->still.p, sizeof(double), np, f) == np
         && fwrite(p->swing.p, sizeof(double), nq, f) == nq && fwrite(&h, sizeof h, 1, f) == 1;
    return fclose(f) || !ok ? "the predictor's file is not written: no space" : NULL;
}

/* The head's values; says which of them cannot be. */
static inline int predictor_head(const uint32_t *head, predictor *p) {
    static const char *const name[PREDICT_HEAD] = {
        "kind", "joints", "vertices of the garment", "vertices of the body", "faces of the garment",
        "inputs", "first layer", "second layer", "outputs"};
    const uint32_t least[PREDICT_HEAD] = {0, 1, 1, 1, 1, 3 * head[1], 1, 1, 3 * head[2]};
    const uint32_t most[PREDICT_HEAD] = {PREDICT_KINDS - 1, 1000, 1000000, 1000000, 2000000,
                                         3 * head[1], 10000, 10000, 3 * head[2]};
    int            i;
    for (i = 0; i < PREDICT_HEAD; i++) {
        if (head[i] >= least[i] && head[i] <= most[i]) continue;
        sprintf(p->said, "the predictor's %s: %lu is not in %lu .. %lu", name[i],
                (unsigned long)head[i], (unsigned long)least[i], (unsigned long)most[i]);
        return 0;
    }
    p->kind = (int)head[0], p->njoints = (int)head[1], p->nv = (int)head[2];
    p->body = (int)head[3], p->nf = (int)head[4];
    return 1;
}

/* Every number is one, every deviation is positive. */
static inline int predictor_numbers(predictor *p) {
    static const char *const name[7] = {"u", "mean of inputs", "deviation of inputs",
                                        "mean of outputs", "deviation of outputs", "parameter",
                                        "parameter of swing"};
    const double *row[7];
    size_t        count[7], i;
    int           k;
    row[0] = p->u, row[5] = p->still.p, row[6] = p->swing.p;
    count[0] = count[3] = count[4] = (size_t)p->still.n[NET_LAYERS];
    count[1] = count[2] = (size_t)p->swing.n[0];
    count[5] = p->still.at[NET_LAYERS], count[6] = p->swing.at[NET_LAYERS];
    for (k = 0; k < 2; k++) row[1 + 2 * k] = p->mean[k], row[2 + 2 * k] = p->over[k];
    for (k = 0; k < 7; k++)
        for (i = 0; i < count[k]; i++) {
            const double a = row[k][i];
            if (fabs(a) <= 1e6 && ((k != 2 && k != 4) || a > 0)) continue;
            sprintf(p->said, "the predictor's %s [%lu]: %g cannot be", name[k], (unsigned long)i,
                    a);
            return 0;
        }
    return 1;
}

/* All of a file up to its end, after the head; 0: p->said. */
static inline int predictor_body(FILE *f, const uint32_t *head, predictor *p) {
    const int    n[NET_LAYERS + 1] = {(int)head[5], (int)head[6], (int)head[7], (int)head[8]};
    const size_t lead = 3 * (size_t)n[3] + 4 * (size_t)n[0];
    size_t       np = 0, nq, bytes;
    uint64_t     h = predict_hash(PREDICT_HASH, "KDSMNET2", 8), want;
    long         size;
    int          l;
    for (l = 0; l < NET_LAYERS; l++) np += ((size_t)n[l] + 1) * (size_t)n[l + 1];
    nq = np + (size_t)n[0] * (size_t)n[1];
    bytes = 8 + 4 * PREDICT_HEAD + 16 + (lead + np + nq) * sizeof(double);
    size = fseek(f, 0, SEEK_END) ? -1 : ftell(f);
    sprintf(p->said, "the predictor's file has %ld bytes, by its head %lu", size,
            (unsigned long)bytes);
    if (size < 0 || (size_t)size != bytes) return 0;
    if (fseek(f, (long)(8 + 4 * PREDICT_HEAD + 8), SEEK_SET)) return 0;
    sprintf(p->said, "out of memory for the predictor's %lu parameters", (unsigned long)(np + nq));
    if (!predictor_room(n, 0, p)) return 0;
    sprintf(p->said, "the predictor's file cannot be read to its end");
    if (fread(p->u, sizeof(double), lead, f) != lead) return 0;
    if (fread(p->still.p, sizeof(double), np, f) != np) return 0;
    if (fread(p->swing.p, sizeof(double), nq, f) != nq) return 0;
    if (fread(&want, sizeof want, 1, f) != 1) return 0;
    if (!predictor_numbers(p)) return 0;
    h = predict_hash(h, head, 4 * PREDICT_HEAD), h = predict_hash(h, &p->id, sizeof p->id);
    h = predict_hash(h, p->u, lead * sizeof(double));
    h = predict_hash(h, p->still.p, np * sizeof(double));
    h = predict_hash(h, p->swing.p, nq * sizeof(double));
    sprintf(p->said, "the predictor's hash: %08lx, of what is in the file %08lx",
            (unsigned long)(want & 0xffffffffu), (unsigned long)(h & 0xffffffffu));
    return h == want;
}

/* NULL, or a sentence that is in *p; predictor_free() either way. */
static inline const char *predictor_read(const char *path, predictor *p) {
    char     magic[8];
    uint32_t head[PREDICT_HEAD];
    int      ok;
    FILE    *f = fopen(path, "rb");
    memset(p, 0, sizeof *p);
    if (!f) return "the predictor's file cannot be opened";
    sprintf(p->said, "the predictor's file does not begin with KDSMNET2");
    ok = fread(magic, 1, 8, f) == 8 && memcmp(magic, "KDSMNET2", 8) == 0;
    if (ok) sprintf(p->said, "the predictor's head is cut short");
    ok = ok && fread(head, 4, PREDICT_HEAD, f) == PREDICT_HEAD
         && fread(&p->id, sizeof p->id, 1, f) == 1;
    ok = ok && predictor_head(head, p) && predictor_body(f, head, p);
    fclose(f);
    if (ok) p->said[0] = 0;
    return ok ? NULL : p->said;
}

#endif
