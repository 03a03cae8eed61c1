/* view.h - writes ONE self-contained HTML page that plays the motion of triangle meshes.
 * SPDX-License-Identifier: MIT
 *
 * Helper of the examples; plain arrays in, one file out; needs libc and libm alone.
 *
 *     view *v = view_open("Hanging sheet", "0.2 kg/m^2, two corners pinned");
 *     int sheet = view_mesh(v, "sheet", VIEW_CLOTH, nv, nf, faces);
 *     view_scalar(v, 0, "stretch", "m/m", VIEW_FACE, 0.9, 1.0, 1.1);
 *     for (...) {
 *         view_time(v, t);                        begins a frame, t rising
 *         view_stretch(nf, faces, x, X, stretch);
 *         view_put(v, sheet, x, stretch, NULL);   a mesh not put stays where it was
 *     }
 *     const char *error = view_close(v, "out/hang.html");
 *     if (error) fprintf(stderr, "out/hang.html: %s\n", error);
 *
 * The page opens from the file system with no network, in WebGL or, where there is none (or
 * with #2d in the address), on a 2D canvas. Drag turns, wheel or pinch zooms, right button or
 * two fingers pan; space plays, arrows step, F is full screen. #t=SECONDS shows that time, paused;
 * #dark and #light choose the theme. The program's source is in the page, behind a button.
 * The light stands still and casts shadows (in 2D on the floor alone); a cloth's back has a colour
 * of its own, the right part of its chip below the picture. view_pattern() gives the front a
 * printed pattern that follows the cloth's pattern coordinates, as it would be cut from a bolt.
 * A still, out/hang.png, is written beside the page.
 * document.title becomes 'ready N frames' after the first drawing, or 'error: ...'.
 *
 * Errors are kept until view_close returns them: no call in between has to be checked, and
 * every call accepts a NULL view. Texts are UTF-8 and copied; arrays are copied.
 *
 * What is stored. Positions are rounded to 16 bits of each mesh's box (23 um for 1.5 m), scalars
 * to 8 bits of the legend's range. Each row of a frame is predicted from the frames before it
 *
 *     predictor p   0: x[i-1]   1: x'   2: 2x' - x''   3, 4: as 1, 2 plus the error at i-1
 *
 * (x' and x'' are the same vertex one and two frames back), the one with the smallest sum of
 * |error| taken, and the errors are written as Rice codes: blocks of 32 share k, an error e is
 * u = 2e or -2e-1, stored as u >> k ones, a zero and the low k bits. The bytes are in base64
 * with two letters replaced.
 * A page never exceeds VIEW_MAX_BYTES: if need be positions get fewer bits, then every second,
 * third, ... frame is left out, and the page says so.
 *
 * Limits: a per-face scalar is drawn as the mean of the faces at a vertex (the range under the
 * legend is that of the faces). Memory: 4 bytes per coordinate and frame until view_close.
 */
#ifndef CLOTHSIM_EXAMPLE_VIEW_H
#define CLOTHSIM_EXAMPLE_VIEW_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "view_page.h"

#define VIEW_MAX_BYTES  4000000     /* of a page                                        */
#define VIEW_MAX_MESHES 32
#define VIEW_MAX_INDEX  4000000     /* vertices or faces of one mesh: the codes' 24 bits */

typedef enum view_kind { VIEW_CLOTH = 0, VIEW_OBSTACLE = 1 } view_kind;
typedef enum view_where { VIEW_VERTEX = 0, VIEW_FACE = 1 } view_where;

typedef struct view_rows {          /* what a mesh showed at each put                   */
    float *data;                    /* [count x width]                                  */
    size_t width;
    int    count, cap;
} view_rows;

typedef struct view_body {
    char     *name;
    view_kind kind;
    int       nv, nf;
    int      *faces;                /* [nf x 3]                                         */
    view_rows x;                    /* width 3 nv, m                                    */
    view_rows s[2];                 /* width nv or nf                                   */
    int      *put;                  /* [frames] the put that a frame shows              */
    int       last;                 /* 1 + the frame of the last put, 0: none           */
    int       nr;                   /* corners: vertices once a texture point, 0: none  */
    int      *rv, *rt, *ruv;        /* [nr] vertex, [nf x 3] faces, [nr x 2] mm         */
    double    lo[3], hi[3];         /* box over all frames, m                           */
} view_body;

typedef struct view_legend {
    char      *name, *unit;         /* name NULL: not used                              */
    view_where where;
    double     lo, mid, hi;
    double     least, most;         /* of the data                                      */
} view_legend;

typedef struct view {
    char       *title, *caption;
    int         up;                 /* 1: y, 2: z                                       */
    double      azimuth, elevation; /* degrees                                          */
    double      floor;              /* m; NAN: automatic                                */
    int         nmesh, frames, cap;
    view_body   mesh[VIEW_MAX_MESHES];
    view_legend legend[2];
    double     *t;                  /* [frames] s                                       */
    long        held;               /* numbers that were not finite or beyond 1e30      */
    const char *file;               /* the program's source, borrowed                   */
    const char *error;              /* the first one, a literal                         */
} view;

typedef struct view_buffer {        /* grows to its limit, then full is set             */
    char    *p;
    size_t   n, cap, limit;
    unsigned acc;                   /* bits not yet written, the low `bits` of it       */
    int      bits, full, failed;
    unsigned group;                 /* bytes waiting for base64                         */
    int      waiting;
} view_buffer;

/* ===== text and bits ===================================================================== */

static inline void view_bytes(view_buffer *b, const char *text, size_t n) {
    if (b->failed || b->full) return;
    if (n > b->limit - b->n) {
        b->full = 1;
        return;
    }
    if (n > b->cap - b->n) {
        size_t cap = b->cap < 65536 ? 65536 : b->cap;
        while (cap < b->n + n) cap *= 2;
        char *p = (char *)realloc(b->p, cap);
        if (p == NULL) {
            b->failed = 1;
            return;
        }
        b->p = p;
        b->cap = cap;
    }
    memcpy(b->p + b->n, text, n);
    b->n += n;
}

static inline void view_text(view_buffer *b, const char *text) {
    view_bytes(b, text, strlen(text));
}

static inline void view_number(view_buffer *b, double v) {
    char text[40];
    snprintf(text, sizeof text, "%.9g", v);
    view_text(b, text);
}

/* a JavaScript string; '<' is escaped so that no text can end the script */
static inline void view_quote(view_buffer *b, const char *s) {
    char code[8];
    view_text(b, "\"");
    for (; *s != '\0'; s++) {
        unsigned char c = (unsigned char)*s;
        if (c < 32 || c == '"' || c == '\\' || c == '<') {
            snprintf(code, sizeof code, "\\u%04x", (unsigned)c);
            view_text(b, code);
        } else view_bytes(b, s, 1);
    }
    view_text(b, "\"");
}

/* base64 with - and . for h and H, so that no data can spell an address */
static inline void view_base64(view_buffer *b, unsigned byte) {
    static const char digit[] =
        "ABCDEFG.IJKLMNOPQRSTUVWXYZabcdefg-ijklmnopqrstuvwxyz0123456789+/";
    char four[4];
    b->group = b->group << 8 | byte;
    if (++b->waiting < 3) return;
    for (int i = 0; i < 4; i++) four[i] = digit[b->group >> (18 - 6 * i) & 63u];
    view_bytes(b, four, 4);
    b->group = 0;
    b->waiting = 0;
}

/* the low n <= 24 bits of v, most significant first */
static inline void view_bits(view_buffer *b, unsigned v, int n) {
    b->acc = b->acc << n | (v & ((1u << n) - 1u));
    b->bits += n;
    while (b->bits >= 8) {
        b->bits -= 8;
        view_base64(b, b->acc >> b->bits & 255u);
    }
    b->acc &= (1u << b->bits) - 1u;
}

/* fills the last group with zeros, which the reader never looks at */
static inline void view_bits_end(view_buffer *b) {
    if (b->bits > 0) view_bits(b, 0, 8 - b->bits);
    while (b->waiting != 0) view_base64(b, 0);
}

/* Rice codes of r [n]; k near log2 of the block's mean is within a fraction of a bit */
static inline void view_rice(view_buffer *b, const int *r, int n) {
    for (int i = 0; i < n; i += 32) {
        int k = 0, end = i + 32 < n ? i + 32 : n;
        double sum = 0;
        for (int j = i; j < end; j++) sum += 2.0 * fabs((double)r[j]);
        while (k < 15 && ldexp((double)(end - i), k) < 0.7 * sum) k++;
        view_bits(b, (unsigned)k, 4);
        for (int j = i; j < end; j++) {
            unsigned u = r[j] < 0 ? 2u * (unsigned)-(r[j] + 1) + 1u : 2u * (unsigned)r[j];
            unsigned q = u >> k;
            if (q < 20) {
                if (q > 0) view_bits(b, (1u << q) - 1u, (int)q);
                view_bits(b, 0, 1);
                if (k > 0) view_bits(b, u, k);
            } else {
                view_bits(b, (1u << 20) - 1u, 20);
                view_bits(b, u, 24);
            }
        }
    }
}

/* one row x [n] after the rows a and b; r [n] is scratch */
static inline void view_row(view_buffer *out, const int *x, const int *a, const int *b, int n,
                            int *r) {
    static const int ca[5] = {0, 1, 2, 1, 2}, cb[5] = {0, 0, 1, 0, 1};
    double best = HUGE_VAL;
    int mode = 0;
    for (int pass = 0; pass < 6; pass++) {
        int p = pass < 5 ? pass : mode, last = 0;
        double sum = 0;
        for (int i = 0; i < n; i++) {
            int d = x[i] - ca[p] * a[i] + cb[p] * b[i];
            r[i] = p == 0 || p > 2 ? d - last : d;
            last = d;
            sum += fabs((double)r[i]);
        }
        if (pass < 5 && sum < best) {
            best = sum;
            mode = p;
        }
    }
    view_bits(out, (unsigned)mode, 3);
    view_rice(out, r, n);
}

#include "view_still.h"

/* ===== building up a view ================================================================ */

static inline char *view_copy(const char *s) {
    size_t n = strlen(s ? s : "") + 1;
    char *p = (char *)malloc(n);
    if (p != NULL) memcpy(p, s ? s : "", n);
    return p;
}

static inline void view_fail(view *v, const char *error) {
    if (v->error == NULL) v->error = error;
}

static inline void view_free(view *v) {
    if (v == NULL) return;
    for (int m = 0; m < v->nmesh; m++) {
        view_body *b = &v->mesh[m];
        free(b->name);
        free(b->faces);
        free(b->x.data);
        free(b->s[0].data);
        free(b->s[1].data);
        free(b->put);
        free(b->rv);
        free(b->rt);
        free(b->ruv);
    }
    for (int k = 0; k < 2; k++) {
        free(v->legend[k].name);
        free(v->legend[k].unit);
    }
    free(v->title);
    free(v->caption);
    free(v->t);
    free(v);
}

/* A new view, or NULL when there is no memory. Title and caption are plain text; file is the
 * program's source, which the page shows where it can be read from here. */
#define view_open(title, caption) view_open_file(title, caption, __FILE__)
static inline view *view_open_file(const char *title, const char *caption, const char *file) {
    view *v = (view *)calloc(1, sizeof *v);
    if (v == NULL) return NULL;
    v->up = 1;
    v->azimuth = 28;
    v->elevation = 14;
    v->floor = (double)NAN;
    v->file = file;
    v->title = view_copy(title);
    v->caption = view_copy(caption);
    if (v->title == NULL || v->caption == NULL) {
        view_free(v);
        return NULL;
    }
    return v;
}

/* Another caption, for figures that are known only after the run. */
static inline void view_caption(view *v, const char *caption) {
    char *copy = v != NULL ? view_copy(caption) : NULL;
    if (v == NULL) return;
    if (copy == NULL) {
        view_fail(v, "out of memory");
        return;
    }
    free(v->caption);
    v->caption = copy;
}

/* The axis that points up: 1 for y (the default), 2 for z. */
static inline void view_up(view *v, int axis) {
    if (v != NULL) v->up = axis == 2 ? 2 : 1;
}

/* First view, degrees: azimuth 0 looks from the front (+z, or -y with z up), 90 from +x. */
static inline void view_camera(view *v, double azimuth, double elevation) {
    if (v == NULL || !isfinite(azimuth) || !isfinite(elevation)) return;
    v->azimuth = azimuth;
    v->elevation = elevation;
}

/* Height of the floor grid, m. Default: 0 where the meshes stand on it, else just below them. */
static inline void view_floor(view *v, double height) {
    if (v != NULL) v->floor = height;
}

/* Adds a mesh of faces [nf x 3] before the first frame; returns its number, -1 on error. */
static inline int view_mesh(view *v, const char *name, view_kind kind, int nv, int nf,
                            const int *faces) {
    if (v == NULL) return -1;
    if (v->nmesh == VIEW_MAX_MESHES || v->frames > 0 || faces == NULL || nv < 3 || nf < 1 ||
        nv > VIEW_MAX_INDEX || nf > VIEW_MAX_INDEX / 3) {
        view_fail(v, "view_mesh: too many meshes, a bad size, or called after a frame");
        return -1;
    }
    for (int i = 0; i < 3 * nf; i++) if (faces[i] < 0 || faces[i] >= nv) {
        view_fail(v, "view_mesh: a face has an index that is no vertex");
        return -1;
    }
    view_body *b = &v->mesh[v->nmesh];
    b->name = view_copy(name);
    b->faces = (int *)malloc(3 * (size_t)nf * sizeof *b->faces);
    if (b->name == NULL || b->faces == NULL) {
        free(b->name);
        free(b->faces);
        memset(b, 0, sizeof *b);
        view_fail(v, "out of memory");
        return -1;
    }
    memcpy(b->faces, faces, 3 * (size_t)nf * sizeof *b->faces);
    b->kind = kind;
    b->nv = nv;
    b->nf = nf;
    b->x.width = 3 * (size_t)nv;
    for (int c = 0; c < 3; c++) {
        b->lo[c] = HUGE_VAL;
        b->hi[c] = -HUGE_VAL;
    }
    return v->nmesh++;
}

/* Gives mesh m, before the first frame, a printed pattern: X [nf x 3 x 2] m, corners as
 * cloth_mesh.X; NULL: none. A vertex whose corners lie at several places, at a seam, is drawn once
 * for each of them. */
static inline void view_pattern(view *v, int m, const double *X) {
    if (v == NULL || X == NULL || v->error != NULL) return;
    if (m < 0 || m >= v->nmesh || v->frames > 0 || v->mesh[m].nr > 0) {
        view_fail(v, "view_pattern: no such mesh, called twice or after a frame");
        return;
    }
    view_body *b = &v->mesh[m];
    size_t     n = 3 * (size_t)b->nf;
    int       *head = (int *)malloc((size_t)b->nv * sizeof(int)), *next;
    next = (int *)malloc(n * sizeof(int));
    b->rv = (int *)malloc(n * sizeof(int)), b->rt = (int *)malloc(n * sizeof(int));
    b->ruv = (int *)malloc(2 * n * sizeof(int));
    if (!head || !next || !b->rv || !b->rt || !b->ruv) view_fail(v, "out of memory");
    for (int i = 0; i < b->nv && v->error == NULL; i++) head[i] = -1;
    for (size_t i = 0; i < n && v->error == NULL; i++) {
        int at = head[b->faces[i]], u[2];
        for (size_t k = 0; k < 2; k++)
            u[k] = (int)floor(fmin(fmax(1e3 * X[2 * i + k], -4e6), 4e6));
        while (at >= 0 && (abs(b->ruv[2 * at] - u[0]) > 1 || abs(b->ruv[2 * at + 1] - u[1]) > 1))
            at = next[at];
        if (at < 0) {
            at = b->nr++;
            b->rv[at] = b->faces[i], b->ruv[2 * at] = u[0], b->ruv[2 * at + 1] = u[1];
            next[at] = head[b->faces[i]], head[b->faces[i]] = at;
        }
        b->rt[i] = at;
    }
    free(head);
    free(next);
}

/* Names scalar 0 (drawn first) or 1 (chosen in the page) before the first frame. The colours
 * run from lo to hi; with lo < mid < hi they part at mid (blue below, red above), else they
 * rise from lo. lo >= hi: the range is taken from the data (99.5 % of it), about mid if finite. */
static inline void view_scalar(view *v, int which, const char *name, const char *unit,
                               view_where where, double lo, double mid, double hi) {
    if (v == NULL) return;
    if (which < 0 || which > 1 || v->frames > 0 || v->legend[which].name != NULL ||
        !(fabs(lo) <= 1e30) || !(fabs(hi) <= 1e30) || (isfinite(mid) && fabs(mid) > 1e30)) {
        view_fail(v, "view_scalar: a bad number, called twice or after a frame");
        return;
    }
    view_legend *l = &v->legend[which];
    l->name = view_copy(name);
    l->unit = view_copy(unit);
    if (l->name == NULL || l->unit == NULL) view_fail(v, "out of memory");
    l->where = where;
    l->lo = lo;
    l->mid = mid;
    l->hi = hi;
    l->least = HUGE_VAL;
    l->most = -HUGE_VAL;
    for (int m = 0; m < v->nmesh; m++)
        v->mesh[m].s[which].width = (size_t)(where == VIEW_FACE ? v->mesh[m].nf : v->mesh[m].nv);
}

/* room for one more row; NULL (and the error kept) when there is none */
static inline float *view_more(view *v, view_rows *r) {
    if (r->count == r->cap) {
        int cap = r->cap < 8 ? 8 : 2 * r->cap;
        float *p = NULL;
        if ((size_t)cap <= (size_t)-1 / (4 * r->width + 4))
            p = (float *)realloc(r->data, (size_t)cap * r->width * sizeof *p);
        if (p == NULL) {
            view_fail(v, "out of memory");
            return NULL;
        }
        r->data = p;
        r->cap = cap;
    }
    return r->data + (size_t)r->count++ * r->width;
}

/* Begins a frame at time t (s), later than the frame before. */
static inline void view_time(view *v, double t) {
    if (v == NULL || v->error != NULL) return;
    if (!isfinite(t) || (v->frames > 0 && !(t > v->t[v->frames - 1]))) {
        view_fail(v, "view_time: times must be finite and rise");
        return;
    }
    if (v->frames == v->cap) {
        int cap = v->cap < 64 ? 64 : 2 * v->cap;
        double *p = (double *)realloc(v->t, (size_t)cap * sizeof *p);
        if (p != NULL) v->t = p;
        for (int m = 0; m < v->nmesh && p != NULL; m++) {
            int *q = (int *)realloc(v->mesh[m].put, (size_t)cap * sizeof *q);
            if (q == NULL) p = NULL;
            else v->mesh[m].put = q;
        }
        if (p == NULL) {
            view_fail(v, "out of memory");
            return;
        }
        v->cap = cap;
    }
    for (int m = 0; m < v->nmesh; m++) v->mesh[m].put[v->frames] = v->mesh[m].x.count - 1;
    v->t[v->frames++] = t;
}

/* Is this a number that the page can hold? Others are counted. */
static inline int view_holds(view *v, double value) {
    int good = fabs(value) <= 1e30;
    v->held += !good;
    return good;
}

static inline void view_put_scalar(view *v, view_body *b, int k, const double *s) {
    view_legend *l = &v->legend[k];
    if (l->name == NULL || (s == NULL && b->s[k].count == 0)) return;
    if (b->s[k].width == 0)
        b->s[k].width = (size_t)(l->where == VIEW_FACE ? b->nf : b->nv);
    if (b->s[k].count < b->x.count - 1) {
        view_fail(v, "view_put: a scalar must be given from a mesh's first frame on");
        return;
    }
    float *p = view_more(v, &b->s[k]);
    if (p == NULL) return;
    for (size_t i = 0; i < b->s[k].width; i++) {
        double value = s != NULL ? s[i] : 0;
        if (!view_holds(v, value)) value = isfinite(l->mid) ? l->mid : 0;
        else {
            l->least = value < l->least ? value : l->least;
            l->most = value > l->most ? value : l->most;
        }
        p[i] = (float)value;
    }
}

/* What mesh m shows from this frame on: x [nv x 3] m; s0 and s1 are the scalars, [nv] or [nf] as
 * view_scalar says, or NULL where the mesh has none. A coordinate that is not finite or beyond 1e30
 * keeps its last value, such a scalar is drawn as mid; the page counts both. */
static inline void view_put(view *v, int m, const double *x, const double *s0, const double *s1) {
    if (v == NULL || v->error != NULL) return;
    if (m < 0 || m >= v->nmesh || x == NULL || v->frames == 0) {
        view_fail(v, "view_put: no such mesh, no positions, or no view_time before it");
        return;
    }
    view_body *b = &v->mesh[m];
    if (b->last == v->frames) {
        view_fail(v, "view_put: the mesh was put twice in one frame");
        return;
    }
    float *p = view_more(v, &b->x);
    if (p == NULL) return;
    const float *before = b->x.count > 1 ? p - b->x.width : NULL;
    for (size_t i = 0; i < b->x.width; i++) {
        double value = x[i];
        int c = (int)(i % 3);
        if (!view_holds(v, value)) value = before != NULL ? (double)before[i] : 0;
        b->lo[c] = value < b->lo[c] ? value : b->lo[c];
        b->hi[c] = value > b->hi[c] ? value : b->hi[c];
        p[i] = (float)value;
    }
    b->put[v->frames - 1] = b->x.count - 1;
    b->last = v->frames;
    view_put_scalar(v, b, 0, s0);
    view_put_scalar(v, b, 1, s1);
}

/* --- a ball: an obstacle of 48 x 24 patches, for spheres --- */

#define VIEW_BALL_NV 1106           /* two poles and 23 rings of 48 */
#define VIEW_BALL_NF 2208

/* Adds a ball before the first frame; returns its number, -1 on error. */
static inline int view_ball(view *v, const char *name) {
    int faces[3 * VIEW_BALL_NF], n = 0;
    for (int j = 0; j < 24; j++) for (int i = 0; i < 48; i++) {
        int a = 48 * (j - 1) + i, b = 48 * (j - 1) + (i + 1) % 48;  /* of the ring above */
        if (j > 0) {
            faces[n++] = a;
            faces[n++] = j < 23 ? a + 48 : VIEW_BALL_NV - 1;
            faces[n++] = b;
        }
        if (j < 23) {
            faces[n++] = j > 0 ? b : VIEW_BALL_NV - 2;
            faces[n++] = a + 48;
            faces[n++] = b + 48;
        }
    }
    return view_mesh(v, name, VIEW_OBSTACLE, VIEW_BALL_NV, VIEW_BALL_NF, faces);
}

/* Vertex i of the ball of radius 1 about the origin. */
static inline void view_ball_point(int i, double x[3]) {
    double up = i < VIEW_BALL_NV - 2 ? (i / 48 + 1) / 24.0 : i - (VIEW_BALL_NV - 2);
    double around = i % 48 / 24.0;
    x[0] = sin(3.14159265358979 * up) * cos(3.14159265358979 * around);
    x[1] = cos(3.14159265358979 * up);
    x[2] = -sin(3.14159265358979 * up) * sin(3.14159265358979 * around);
}

/* Puts ball m around c, radius r, m. */
static inline void view_put_ball(view *v, int m, const double c[3], double r) {
    double x[3 * VIEW_BALL_NV];
    for (int i = 0; i < VIEW_BALL_NV; i++) {
        view_ball_point(i, x + 3 * i);
        for (int k = 0; k < 3; k++) x[3 * i + k] = c[k] + r * x[3 * i + k];
    }
    view_put(v, m, x, NULL, NULL);
}

/* The short form for one mesh (number 0): a frame at t with x [nv x 3] and scalar 0 or NULL. */
static inline void view_frame(view *v, double t, const double *x, const double *s) {
    view_time(v, t);
    view_put(v, 0, x, s, NULL);
}

/* s [nf]: the principal stretch farthest from 1 (on a log scale) of each triangle, from rest
 * corners X [nf x 3 x 2] m and positions x [nv x 3] m. With F = dx/dX, C = F'F has the squared
 * stretches as eigenvalues: mean +- sqrt(half difference^2 + C12^2). */
static inline void view_stretch(int nf, const int *faces, const double *x, const double *X,
                                double *s) {
    for (int f = 0; f < nf; f++) {
        const double *a = x + 3 * faces[3 * f], *b = x + 3 * faces[3 * f + 1];
        const double *c = x + 3 * faces[3 * f + 2], *R = X + 6 * f;
        double p = R[2] - R[0], q = R[3] - R[1], r = R[4] - R[0], t = R[5] - R[1];
        double det = p * t - q * r, c11 = 0, c12 = 0, c22 = 0;
        for (int i = 0; i < 3; i++) {
            double u = b[i] - a[i], w = c[i] - a[i];
            double f1 = (u * t - w * q) / det, f2 = (w * p - u * r) / det;
            c11 += f1 * f1;
            c12 += f1 * f2;
            c22 += f2 * f2;
        }
        double mean = 0.5 * (c11 + c22), rad = sqrt(0.25 * (c11 - c22) * (c11 - c22) + c12 * c12);
        double most = sqrt(mean + rad), least = sqrt(mean > rad ? mean - rad : 0);
        s[f] = most * least > 1 ? most : least;
    }
}

/* ===== writing =========================================================================== */

/* the range that holds 99.5 % of scalar k: a histogram of the distance from mid or from least */
static inline void view_range(view *v, int k) {
    view_legend *l = &v->legend[k];
    int two = isfinite(l->mid) && (l->lo < l->hi ? l->lo < l->mid && l->mid < l->hi
                                                 : l->least < l->mid);
    if (!(l->least <= l->most)) l->least = l->most = isfinite(l->mid) ? l->mid : 0;
    if (l->lo < l->hi) {
        if (!two) l->mid = (double)NAN;
        return;
    }
    double from = two ? l->mid : l->least, reach = l->most - from, total = 0, sum = 0;
    double count[1024];
    int i = 0;
    memset(count, 0, sizeof count);
    if (two && l->mid - l->least > reach) reach = l->mid - l->least;
    if (!(reach > 1e-12)) reach = 1e-12;
    for (int m = 0; m < v->nmesh; m++) {
        const view_rows *r = &v->mesh[m].s[k];
        for (size_t j = 0; j < r->width * (size_t)r->count; j++) {
            double d = fabs((double)r->data[j] - from) / reach * 1023;
            count[d < 1023 ? (int)d : 1023]++;
            total++;
        }
    }
    while (i < 1023 && (sum += count[i]) < 0.995 * total) i++;
    double want = reach * (i + 1) / 1024, p = pow(10, floor(log10(want)));
    double nice = want / p > 5 ? 10 * p : want / p > 2 ? 5 * p : want / p > 1 ? 2 * p : p;
    l->lo = two ? l->mid - nice : from;
    l->hi = from + nice;
    if (!two) l->mid = (double)NAN;
}

/* the rows of one array, quantised to 0..levels by (value - lo) / step per part */
static inline void view_stream(view_buffer *out, const view_rows *r, const int *put, int frames,
                               int stride, int parts, const double *lo, const double *step,
                               int levels, int *q) {
    int n = (int)r->width / parts, still = r->count < 2, width = (int)r->width;
    int *now = q, *a = q + width, *b = q + 2 * width, *scratch = q + 3 * width;
    out->acc = out->group = 0;
    out->bits = out->waiting = 0;
    memset(q, 0, 3 * r->width * sizeof *q);
    for (int f = 0, done = 0; f < frames && !out->full && !out->failed; f += stride, done++) {
        int at = put[f] < 0 ? 0 : put[f];
        const float *row = r->data + (size_t)at * r->width;
        for (int i = 0; i < width; i++) {
            int c = i % parts;
            double u = step[c] > 0 ? floor(((double)row[i] - lo[c]) / step[c] + 0.5) : 0;
            now[c * n + i / parts] = u < 0 ? 0 : u > levels ? levels : (int)u;
        }
        for (int c = 0; c < parts; c++)
            view_row(out, now + c * n, a + c * n, (done > 1 ? b : a) + c * n, n, scratch);
        int *spare = b;
        b = a;
        a = now;
        now = spare;
        if (still) break;
    }
    view_bits_end(out);
}

static inline void view_write_scalar(view_buffer *out, const view *v, const view_body *b, int k,
                                     int stride, int *q) {
    const view_legend *l = &v->legend[k];
    double step = (l->hi - l->lo) / 255;
    if (b->s[k].count == 0) {
        view_text(out, "null");
        return;
    }
    view_text(out, l->where == VIEW_FACE ? "{face:true,frames:" : "{face:false,frames:");
    view_number(out, b->s[k].count < 2 ? 1 : (v->frames + stride - 1) / stride);
    view_text(out, ",data:'");
    view_stream(out, &b->s[k], b->put, v->frames, stride, 1, &l->lo, &step, 255, q);
    view_text(out, "'}");
}

/* ,name:'the differences of a [n], each from the one before' */
static inline void view_write_sums(view_buffer *out, const char *name, const int *a, int n,
                                   int *q) {
    for (int i = 0, last = 0; i < n; i++) {
        q[i] = a[i] - last;
        last = a[i];
    }
    view_text(out, name);
    out->acc = out->group = 0;
    out->bits = out->waiting = 0;
    view_rice(out, q, n);
    view_bits_end(out);
    view_text(out, "'");
}

static inline void view_write_mesh(view_buffer *out, const view *v, int m, int stride, int bits,
                                   int *q) {
    const view_body *b = &v->mesh[m];
    int levels = (1 << bits) - 1, tone = 0;
    double step[3];
    for (int i = 0; i < m; i++) tone += v->mesh[i].kind == VIEW_CLOTH;
    view_text(out, "{name:");
    view_quote(out, b->name);
    view_text(out, b->kind == VIEW_CLOTH ? ",cloth:true,tone:" : ",cloth:false,tone:");
    view_number(out, tone);
    view_text(out, ",nv:");
    view_number(out, b->nv);
    view_text(out, ",nf:");
    view_number(out, b->nf);
    view_text(out, ",frames:");
    view_number(out, b->x.count < 2 ? 1 : (v->frames + stride - 1) / stride);
    view_text(out, ",levels:");
    view_number(out, levels);
    for (int k = 0; k < 2; k++) {
        view_text(out, k == 0 ? ",lo:[" : ",step:[");
        for (int c = 0; c < 3; c++) {
            step[c] = (b->hi[c] - b->lo[c]) / levels;
            view_number(out, k == 0 ? b->lo[c] : step[c]);
            view_text(out, c < 2 ? "," : "]");
        }
    }
    view_write_sums(out, ",\nfaces:'", b->faces, 3 * b->nf, q);
    if (b->nr > 0) {
        view_text(out, ",nr:");
        view_number(out, b->nr);
        view_write_sums(out, ",rv:'", b->rv, b->nr, q);
        view_write_sums(out, ",rt:'", b->rt, 3 * b->nf, q);
        view_write_sums(out, ",ruv:'", b->ruv, 2 * b->nr, q);
    }
    view_text(out, ",\nx:'");
    view_stream(out, &b->x, b->put, v->frames, stride, 3, b->lo, step, levels, q);
    view_text(out, "',\ns:[");
    view_write_scalar(out, v, b, 0, stride, q);
    view_text(out, ",\n");
    view_write_scalar(out, v, b, 1, stride, q);
    view_text(out, "]}");
}

/* least and most of scalar k in one frame, over all meshes */
static inline void view_write_extent(view_buffer *out, const view *v, int k, int f) {
    double lo = HUGE_VAL, hi = -HUGE_VAL;
    for (int m = 0; m < v->nmesh; m++) {
        const view_body *b = &v->mesh[m];
        const view_rows *r = &b->s[k];
        int at = b->put[f] < r->count ? b->put[f] : r->count - 1;
        for (size_t i = 0; at >= 0 && i < r->width; i++) {
            double value = (double)r->data[(size_t)at * r->width + i];
            lo = value < lo ? value : lo;
            hi = value > hi ? value : hi;
        }
    }
    if (lo > hi) lo = hi = 0;
    view_text(out, "[");
    view_number(out, lo);
    view_text(out, ",");
    view_number(out, hi);
    view_text(out, "],");
}

static inline void view_write_legend(view_buffer *out, const view *v, int k, int stride) {
    const view_legend *l = &v->legend[k];
    static const char *const key[5] = {",lo:", ",mid:", ",hi:", ",min:", ",max:"};
    double value[5];
    value[0] = l->lo;
    value[1] = isfinite(l->mid) ? l->mid : l->lo;
    value[2] = l->hi;
    value[3] = l->least;
    value[4] = l->most;
    view_text(out, "{name:");
    view_quote(out, l->name);
    view_text(out, ",unit:");
    view_quote(out, l->unit);
    view_text(out, isfinite(l->mid) ? ",two:true" : ",two:false");
    for (int i = 0; i < 5; i++) {
        view_text(out, key[i]);
        view_number(out, value[i]);
    }
    view_text(out, ",ranges:[");
    for (int f = 0; f < v->frames; f += stride) view_write_extent(out, v, k, f);
    view_text(out, "]},");
}

/* what the page says about its own data */
static inline void view_write_note(view_buffer *out, const view *v, int stride, int bits) {
    char text[400];
    double reach = 0;
    int n;
    for (int m = 0; m < v->nmesh; m++)
        for (int c = 0; c < 3; c++)
            if (v->mesh[m].hi[c] - v->mesh[m].lo[c] > reach)
                reach = v->mesh[m].hi[c] - v->mesh[m].lo[c];
    n = snprintf(text, sizeof text, "Positions are stored in %d bits (steps of %.2g mm).", bits,
                 1e3 * reach / ((1 << bits) - 1));
    if (stride > 1 && n > 0)
        n += snprintf(text + n, sizeof text - (size_t)n,
                      " To stay below %d MB the page holds one frame in %d of the %d simulated.",
                      VIEW_MAX_BYTES / 1000000, stride, v->frames);
    if (v->held > 0 && n > 0)
        snprintf(text + n, sizeof text - (size_t)n,
                 " %ld values were not finite or beyond 1e30; such positions are the last "
                 "ones before.",
                 v->held);
    view_quote(out, text);
}

/* the program's text, where it can be read */
static inline void view_write_source(view_buffer *out, const view *v) {
    FILE *file = v->file != NULL ? fopen(v->file, "rb") : NULL;
    char *text = file != NULL ? (char *)calloc(1, 100001) : NULL;
    if (text != NULL && fread(text, 1, 100000, file) > 0) {
        view_text(out, ",source:");
        view_quote(out, text);
    }
    free(text);
    if (file != NULL) fclose(file);
}

static inline void view_write_page(view_buffer *out, const view *v, int stride, int bits, int *q) {
    for (int i = 0; view_page_head[i] != NULL; i++) view_text(out, view_page_head[i]);
    view_text(out, "const D = {title:");
    view_quote(out, v->title);
    view_text(out, ",caption:");
    view_quote(out, v->caption);
    view_text(out, ",note:");
    view_write_note(out, v, stride, bits);
    view_write_source(out, v);
    view_text(out, ",tone:");
    view_number(out, view_tone(v));
    view_text(out, v->up == 2 ? ",up:2,floor:" : ",up:1,floor:");
    if (isfinite(v->floor)) view_number(out, v->floor);
    else view_text(out, "null");
    view_text(out, ",camera:[");
    view_number(out, v->azimuth);
    view_text(out, ",");
    view_number(out, v->elevation);
    view_text(out, "],\ntimes:[");
    for (int f = 0; f < v->frames; f += stride) {
        view_number(out, v->t[f]);
        view_text(out, ",");
    }
    view_text(out, "],\nscalars:[");
    for (int k = 0; k < 2; k++) if (v->legend[k].name != NULL) view_write_legend(out, v, k, stride);
    view_text(out, "],\nmeshes:[");
    for (int m = 0; m < v->nmesh && !out->full; m++) {
        view_write_mesh(out, v, m, stride, bits, q);
        view_text(out, ",\n");
    }
    view_text(out, "]};\n");
    for (int i = 0; view_page_code[i] != NULL; i++) view_text(out, view_page_code[i]);
}

static inline const char *view_save(const view_buffer *b, const char *path) {
    FILE *file = fopen(path, "wb");
    if (file == NULL) return "the file cannot be opened for writing";
    size_t n = fwrite(b->p, 1, b->n, file);
    int bad = n != b->n;
    if (fclose(file) != 0) bad = 1;
    return bad ? "writing the file failed; what is there is incomplete" : NULL;
}

/* the still beside the page: the same name with the ending .png */
static inline const char *view_finish_still(const view *v, const char *path) {
    const size_t n = strlen(path);
    const char  *error = NULL;
    view_buffer  out;
    char        *name = n > 5 && strcmp(path + n - 5, ".html") == 0 ? view_copy(path) : NULL;
    if (name == NULL) return NULL;
    memset(&out, 0, sizeof out);
    out.limit = VIEW_MAX_BYTES;
    memcpy(name + n - 5, ".png", 5);
    view_still(&out, v, (int)(0.6 * (v->frames - 1)));
    error = out.failed ? "out of memory" : view_save(&out, name);
    free(name);
    free(out.p);
    return error;
}

/* finds the finest storage that fits, and writes it */
static inline const char *view_finish(view *v, const char *path) {
    static const int stride[] = {1, 1, 1, 1, 2, 2, 3, 4, 6, 8, 12, 16, 24, 32, 64, 128};
    static const int bits[] = {16, 15, 14, 13, 14, 13, 13, 13, 13, 13, 12, 12, 12, 12, 12, 12};
    view_buffer out;
    size_t most = 0;
    const char *error = "the meshes do not fit into one page";
    for (int m = 0; m < v->nmesh; m++) {
        const view_body *b = &v->mesh[m];
        if (b->x.count == 0) return "a mesh was never put";
        if ((size_t)(b->nv > b->nf ? b->nv : b->nf) > most)
            most = (size_t)(b->nv > b->nf ? b->nv : b->nf);
    }
    if (v->legend[1].name != NULL && v->legend[0].name == NULL)
        return "scalar 1 was named without scalar 0";
    for (int k = 0; k < 2; k++) if (v->legend[k].name != NULL) view_range(v, k);
    int *q = (int *)malloc(12 * most * sizeof *q);
    memset(&out, 0, sizeof out);
    out.limit = VIEW_MAX_BYTES;
    for (size_t i = 0; q != NULL && i < sizeof stride / sizeof *stride; i++) {
        out.n = 0;
        out.full = 0;
        view_write_page(&out, v, stride[i], bits[i], q);
        if (out.failed || !out.full) break;
    }
    if (q == NULL || out.failed) error = "out of memory";
    else if (!out.full) error = view_save(&out, path);
    free(q);
    free(out.p);
    return error;
}

/* Writes the page and frees the view in every case. Returns NULL, or what went wrong as a
 * literal text; a file that was begun and could not be finished is left as it is. */
static inline const char *view_close(view *v, const char *path) {
    if (v == NULL) return "out of memory";
    const char *error = v->error;
    if (error == NULL && (v->frames == 0 || v->nmesh == 0)) error = "there is no frame to show";
    if (error == NULL) error = view_finish(v, path);
    if (error == NULL) error = view_finish_still(v, path);
    view_free(v);
    return error;
}

#endif
