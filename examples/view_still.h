/* view_still.h - one frame of a view as a small PNG, drawn without a graphics card.
 * SPDX-License-Identifier: MIT
 *
 * Included by view.h after its types. Perspective, a depth buffer, four samples a pixel, the light
 * and colours of the page's first view; shadows on the floor alone; where nothing is, nothing is
 * painted, so that it serves light and dark pages. The PNG is not compressed. */
#ifndef CLOTHSIM_EXAMPLE_VIEW_STILL_H
#define CLOTHSIM_EXAMPLE_VIEW_STILL_H

#define VIEW_STILL_W 480
#define VIEW_STILL_H 300
#define VIEW_STILL_S 2              /* samples along a pixel's side */
#define VIEW_STILL_SHADOW 31        /* of 255: how dark             */

typedef struct view_raster {
    int            w, h;
    float         *depth;           /* [w x h] distance along the axis; 0: nothing */
    unsigned char *rgba;            /* [w x h x 4]                                 */
    double         r[3], u[3], b[3], at[3], far_off, light[3], focus;
    double         floor_y;
} view_raster;

/* What view.h's page has: front, pattern, back. */
static const unsigned char view_fabric[4][9] = {{30, 92, 126, 240, 230, 210, 226, 140, 84},
                                                {190, 68, 60, 248, 226, 200, 66, 84, 126},
                                                {226, 172, 62, 253, 243, 220, 104, 76, 118},
                                                {78, 124, 86, 230, 236, 212, 184, 96, 100}};

/* Which fabric is first: by the title, so that pages differ. */
static inline int view_tone(const view *v) {
    int sum = 0;
    for (const char *s = v->title; *s != 0; s++) sum += *s & 127;
    return sum % 4;
}

static inline double view_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* s [3]: pixels and the distance along the axis */
static inline void view_project(const view_raster *a, const double *p, double *s) {
    double d[3];
    for (int k = 0; k < 3; k++) d[k] = p[k] - a->at[k];
    s[2] = a->far_off - view_dot(a->b, d);
    s[0] = 0.5 * a->w + a->focus * view_dot(a->r, d) / s[2];
    s[1] = 0.5 * a->h - a->focus * view_dot(a->u, d) / s[2];
}

/* Vertex i of mesh m at frame f, y up. */
static inline void view_vertex(const view *v, int m, int f, int i, double *p) {
    const view_body *b = &v->mesh[m];
    const float     *x = b->x.data + (size_t)(b->put[f] < 0 ? 0 : b->put[f]) * b->x.width + 3 * i;
    p[0] = (double)x[0];
    p[1] = v->up == 2 ? (double)x[2] : (double)x[1];
    p[2] = v->up == 2 ? -(double)x[1] : (double)x[2];
}

/* 0 or 1, for fabrics as the page prints them */
static inline double view_weave(int tone, double s, double t) {
    const double a = 2 * fabs(s - floor(s) - 0.5), c = 2 * fabs(t - floor(t) - 0.5);
    switch (tone) {
    case 0:  return 0.5 * (a > 0.5) + 0.5 * (c > 0.5);
    case 1:  return a > 0.62;
    case 2:  return 0.85 * (a > 0.86 || c > 0.86);
    default: return 0.42 * (a > 0.5) + 0.42 * (c > 0.5);
    }
}

/* Corners s [3 x 3] on the screen: calls shade through colour(ctx, weights, front) where nearest;
 * ctx NULL: darkens what is there, once (a shadow). */
typedef struct view_paint {
    const double *n;                /* [3 x 3] normals           */
    double        uv[6];            /* periods                   */
    int           tone, cloth, patterned;
} view_paint;

static inline void view_shade(const view_raster *a, const view_paint *p, const double *w, int front,
                              unsigned char *rgba) {
    double n[3], size = 0, k, sky, part = 0;
    for (int i = 0; i < 3; i++) {
        n[i] = w[0] * p->n[i] + w[1] * p->n[3 + i] + w[2] * p->n[6 + i];
        size += n[i] * n[i];
    }
    size = (front ? 1 : -1) / (size > 0 ? sqrt(size) : 1);
    for (int i = 0; i < 3; i++) n[i] *= size;
    k = view_dot(n, a->light), sky = 0.5 + 0.5 * n[1];
    k = 0.3 + 0.14 * sky + 0.72 * (k > 0 ? k : 0) + 0.22 * fabs(view_dot(n, a->b));
    if (p->patterned && front)
        part = view_weave(p->tone, w[0] * p->uv[0] + w[1] * p->uv[2] + w[2] * p->uv[4],
                          w[0] * p->uv[1] + w[1] * p->uv[3] + w[2] * p->uv[5]);
    for (int i = 0; i < 3; i++) {
        const unsigned char *c = view_fabric[p->tone];
        double base = !p->cloth ? 186 - 9 * i : !front ? c[6 + i] : c[i] + part * (c[3 + i] - c[i]);
        base *= pow(k, 1 / 2.2);
        rgba[i] = (unsigned char)(base < 255 ? base : 255);
    }
    rgba[3] = 255;
}

static inline void view_fill(view_raster *a, const double *s, const view_paint *p) {
    const double area = (s[3] - s[0]) * (s[7] - s[1]) - (s[6] - s[0]) * (s[4] - s[1]);
    double       lo[2], hi[2];
    if (!(fabs(area) > 1e-9) || s[2] <= 0 || s[5] <= 0 || s[8] <= 0) return;
    for (int k = 0; k < 2; k++) {
        lo[k] = floor(fmax(fmin(fmin(s[k], s[3 + k]), s[6 + k]), 0));
        hi[k] = ceil(fmin(fmax(fmax(s[k], s[3 + k]), s[6 + k]), (k ? a->h : a->w) - 1));
    }
    for (int y = (int)lo[1]; y <= (int)hi[1]; y++) for (int x = (int)lo[0]; x <= (int)hi[0]; x++) {
        const size_t i = (size_t)y * (size_t)a->w + (size_t)x;
        double       w[3], z;
        for (int k = 0; k < 3; k++) {
            const double *q = s + 3 * ((k + 1) % 3), *t = s + 3 * ((k + 2) % 3);
            w[k] = ((q[0] - x) * (t[1] - y) - (t[0] - x) * (q[1] - y)) / area;
        }
        if (w[0] < 0 || w[1] < 0 || w[2] < 0) continue;
        z = w[0] * s[2] + w[1] * s[5] + w[2] * s[8];
        if (p == NULL) {
            a->rgba[4 * i + 3] = VIEW_STILL_SHADOW;
        } else if (!(a->depth[i] > 0) || z < (double)a->depth[i]) {
            a->depth[i] = (float)z;
            view_shade(a, p, w, area < 0, a->rgba + 4 * i);
        }
    }
}

/* The camera that shows all of what is sampled, as reset() of the page. */
static inline void view_aim(view_raster *a, const view *v, int f) {
    const double turn = v->azimuth * 3.14159265358979 / 180;
    const double rise = v->elevation * 3.14159265358979 / 180;
    const double ca = cos(turn), sa = sin(turn), ce = cos(rise), se = sin(rise);
    const double b[3] = {sa * ce, se, ca * ce}, r[3] = {ca, 0, -sa};
    const double u[3] = {-sa * se, ce, -ca * se};
    double       lo[3] = {1e30, 1e30, 1e30}, hi[3] = {-1e30, -1e30, -1e30}, p[3], s[3], size = 0;
    const double light[3] = {-0.6 * ca + 0.36 * sa, 0.7, 0.6 * sa + 0.36 * ca};
    const double length = sqrt(view_dot(light, light));
    for (int m = 0; m < v->nmesh; m++) for (int i = 0; i < v->mesh[m].nv; i++) {
        view_vertex(v, m, f, i, p);
        for (int k = 0; k < 3; k++) lo[k] = fmin(lo[k], p[k]), hi[k] = fmax(hi[k], p[k]);
    }
    for (int k = 0; k < 3; k++) {
        a->b[k] = b[k], a->r[k] = r[k], a->u[k] = u[k], a->light[k] = light[k] / length;
        a->at[k] = 0.5 * (lo[k] + hi[k]);
        size = fmax(size, hi[k] - lo[k]);
    }
    a->floor_y = isfinite(v->floor) ? v->floor
               : lo[1] >= -1e-3 * size && lo[1] < 0.5 * size ? 0 : lo[1] - 0.03 * size;
    a->focus = 0.5 * a->h / tan(15 * 3.14159265358979 / 180);
    a->far_off = 4 * size;
    for (int pass = 0; pass < 6; pass++) {
        double box[4] = {1e30, 1e30, -1e30, -1e30};
        for (int m = 0; m < v->nmesh; m++) for (int i = 0; i < v->mesh[m].nv; i++) {
            view_vertex(v, m, f, i, p);
            view_project(a, p, s);
            box[0] = fmin(box[0], s[0]), box[1] = fmin(box[1], s[1]);
            box[2] = fmax(box[2], s[0]), box[3] = fmax(box[3], s[1]);
        }
        for (int k = 0; k < 3; k++)
            a->at[k] += a->far_off / a->focus * ((0.5 * (box[0] + box[2]) - 0.5 * a->w) * r[k] -
                                                 (0.5 * (box[1] + box[3]) - 0.5 * a->h) * u[k]);
        a->far_off *= fmax((box[2] - box[0]) / (0.9 * a->w), (box[3] - box[1]) / (0.9 * a->h));
    }
}

static inline void view_draw_mesh(view_raster *a, const view *v, int m, int f, int tone) {
    const view_body *b = &v->mesh[m];
    double          *x = (double *)calloc(6 * (size_t)b->nv, sizeof *x), *n = x + 3 * b->nv;
    double           lo[2] = {1e30, 1e30}, hi[2] = {-1e30, -1e30}, period;
    static const double count[4] = {13, 9, 13, 7};
    if (x == NULL) return;
    for (int i = 0; i < b->nv; i++) view_vertex(v, m, f, i, x + 3 * i);
    for (int i = 0; i < 3 * b->nf; i += 3) {
        const double *p = x + 3 * b->faces[i], *q = x + 3 * b->faces[i + 1];
        const double *t = x + 3 * b->faces[i + 2];
        for (int k = 0; k < 3; k++) {
            const int    y = (k + 1) % 3, z = (k + 2) % 3;
            const double c = (q[y] - p[y]) * (t[z] - p[z]) - (q[z] - p[z]) * (t[y] - p[y]);
            for (int e = 0; e < 3; e++) n[3 * b->faces[i + e] + k] += c;
        }
    }
    for (int i = 0; i < 2 * b->nr; i++) {
        lo[i % 2] = fmin(lo[i % 2], b->ruv[i]), hi[i % 2] = fmax(hi[i % 2], b->ruv[i]);
    }
    period = fmin(fmax(hi[0] - lo[0], hi[1] - lo[1]) / count[tone % 4], 60);     /* mm */
    for (int i = 0; i < 3 * b->nf; i += 3) {
        double     s[9], nn[9];
        view_paint paint = {NULL, {0, 0, 0, 0, 0, 0}, 0, 0, 0};
        paint.n = nn, paint.tone = tone % 4, paint.cloth = b->kind == VIEW_CLOTH;
        paint.patterned = b->nr > 0;
        for (int e = 0; e < 3; e++) {
            view_project(a, x + 3 * b->faces[i + e], s + 3 * e);
            memcpy(nn + 3 * e, n + 3 * b->faces[i + e], 3 * sizeof(double));
            for (int k = 0; k < 2 && b->nr > 0; k++)
                paint.uv[2 * e + k] = (b->ruv[2 * b->rt[i + e] + k] - lo[k]) / period;
        }
        view_fill(a, s, &paint);
    }
    free(x);
}

static inline void view_draw_shadow(view_raster *a, const view *v, int m, int f) {
    const view_body *b = &v->mesh[m];
    for (int i = 0; i < 3 * b->nf; i += 3) {
        double s[9], p[3];
        for (int e = 0; e < 3; e++) {
            view_vertex(v, m, f, b->faces[i + e], p);
            for (int k = 0; k < 3; k++)
                p[k] -= k == 1 ? 0 : (p[1] - a->floor_y) / a->light[1] * a->light[k];
            p[1] = a->floor_y;
            view_project(a, p, s + 3 * e);
        }
        view_fill(a, s, NULL);
    }
}

static inline void view_png_chunk(view_buffer *out, const char *kind, const unsigned char *data,
                                  size_t n) {
    const size_t  start = out->n + 4;
    unsigned      crc = 0xffffffffu;
    unsigned char be[4];
    for (int k = 0; k < 4; k++) be[k] = (unsigned char)(n >> (24 - 8 * k));
    view_bytes(out, (const char *)be, 4);
    view_bytes(out, kind, 4);
    view_bytes(out, (const char *)data, n);
    if (out->failed || out->full) return;
    for (size_t i = start; i < out->n; i++) {
        crc ^= (unsigned char)out->p[i];
        for (int k = 0; k < 8; k++) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
    }
    for (int k = 0; k < 4; k++) be[k] = (unsigned char)(~crc >> (24 - 8 * k));
    view_bytes(out, (const char *)be, 4);
}

/* z: a zlib stream of stored blocks of the rows, each behind a filter byte of 0 */
static inline void view_png(view_buffer *out, const unsigned char *rgba, int w, int h) {
    const unsigned char head[13] = {(unsigned char)(w >> 24), (unsigned char)(w >> 16),
        (unsigned char)(w >> 8), (unsigned char)w, (unsigned char)(h >> 24),
        (unsigned char)(h >> 16), (unsigned char)(h >> 8), (unsigned char)h, 8, 6, 0, 0, 0};
    const size_t   row = 4 * (size_t)w, line = row + 1;
    unsigned       a = 1, b = 0;
    unsigned char *z = (unsigned char *)malloc((line + 5) * (size_t)h + 6), *p = z;
    if (z == NULL) {
        out->failed = 1;
        return;
    }
    *p++ = 0x78, *p++ = 0x01;
    for (int y = 0; y < h; y++) {
        *p++ = y == h - 1;
        *p++ = (unsigned char)line, *p++ = (unsigned char)(line >> 8);
        *p++ = (unsigned char)~line, *p++ = (unsigned char)(~line >> 8);
        *p = 0;
        memcpy(p + 1, rgba + row * (size_t)y, row);
        for (size_t i = 0; i < line; i++) a = (a + p[i]) % 65521, b = (b + a) % 65521;
        p += line;
    }
    for (int k = 0; k < 4; k++) *p++ = (unsigned char)((b << 16 | a) >> (24 - 8 * k));
    view_bytes(out, "\211PNG\r\n\032\n", 8);
    view_png_chunk(out, "IHDR", head, 13);
    view_png_chunk(out, "IDAT", z, (size_t)(p - z));
    view_png_chunk(out, "IEND", head, 0);
    free(z);
}

/* The mean of a pixel's samples, each by how much it covers. */
static inline void view_pixel(const view_raster *a, int x, int y, unsigned char *rgba) {
    enum { S = VIEW_STILL_S };
    int sum[4] = {0};
    for (int k = 0; k < S * S; k++) {
        const unsigned char *q = a->rgba + 4 * ((y * S + k / S) * a->w + x * S + k % S);
        for (int i = 0; i < 3; i++) sum[i] += q[i] * q[3];
        sum[3] += q[3];
    }
    for (int i = 0; i < 3; i++) rgba[i] = (unsigned char)(sum[3] > 0 ? sum[i] / sum[3] : 0);
    rgba[3] = (unsigned char)(sum[3] / (S * S));
}

/* Frame f as PNG, appended to out. */
static inline void view_still(view_buffer *out, const view *v, int f) {
    const int      w = VIEW_STILL_W, h = VIEW_STILL_H, s = VIEW_STILL_S;
    int            tone = view_tone(v);
    view_raster    a;
    unsigned char *rgba = (unsigned char *)malloc(4 * (size_t)(w * h));
    memset(&a, 0, sizeof a);
    a.w = w * s, a.h = h * s;
    a.depth = (float *)calloc((size_t)(a.w * a.h), sizeof *a.depth);
    a.rgba = (unsigned char *)calloc((size_t)(a.w * a.h), 4);
    if (rgba == NULL || a.depth == NULL || a.rgba == NULL) out->failed = 1;
    else {
        view_aim(&a, v, f);
        for (int m = 0; m < v->nmesh; m++) view_draw_shadow(&a, v, m, f);
        for (int m = 0; m < v->nmesh; m++) {
            view_draw_mesh(&a, v, m, f, tone);
            tone += v->mesh[m].kind == VIEW_CLOTH;
        }
        for (int i = 0; i < w * h; i++) view_pixel(&a, i % w, i / w, rgba + 4 * i);
        view_png(out, rgba, w, h);
    }
    free(rgba), free(a.depth), free(a.rgba);
}

#endif
