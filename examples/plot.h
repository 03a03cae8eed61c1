/* plot.h - writes ONE line chart as an SVG file.
 * SPDX-License-Identifier: MIT
 *
 * Helper of the examples and benchmarks; plain numbers in, one file out; libc and libm alone.
 *
 *     plot *p = plot_open("Error against cost", "CPU time per simulated second (s)", "error (m)");
 *     plot_axes(p, 1, 1);                                   both logarithmic
 *     int euler = plot_series(p, "implicit Euler");
 *     plot_point(p, euler, 0.25, 4.2e-2, "240 Hz");         the label names the knob's setting
 *     plot_fit(p, euler);                                   its slope, as a triangle
 *     plot_hline(p, 5e-4, "must reach");
 *     const char *error = plot_close(p, "out/chart.svg");
 *
 * Readable at 720 px wide; colours (Okabe and Ito's, safe for colour-blind readers), markers and
 * dashes all differ; light or dark with the reader's setting. The legend stands above the data
 * area. A point whose y is NaN or beyond 1e300 (or <= 0 on a log axis) is a failed run: an x at the
 * top edge. A point whose x is such is left out, and a line under the chart counts them.
 *
 * Errors are kept until plot_close returns them; every call accepts a NULL plot. Texts are UTF-8
 * and copied. Lines join the points of a series in the order given; they break at failed runs.
 */
#ifndef CLOTHSIM_EXAMPLE_PLOT_H
#define CLOTHSIM_EXAMPLE_PLOT_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PLOT_MAX_SERIES 14
#define PLOT_MAX_RULES  8
#define PLOT_WIDTH      720.0       /* px, all below too                                */
#define PLOT_LEFT       78.0
#define PLOT_RIGHT      22.0
#define PLOT_INNER      400.0       /* height of the data area                          */

typedef struct plot_mark {
    double x, y;
    char  *label;                   /* NULL: none                                       */
} plot_mark;

typedef struct plot_line {
    char      *name;
    plot_mark *p;                   /* [n]                                              */
    int        n, cap, fit;
} plot_line;

typedef struct plot_rule {
    int    vertical;
    double at;
    char  *label;
} plot_rule;

typedef struct plot_box {           /* taken space, for placing labels                  */
    double x0, y0, x1, y1;
} plot_box;

typedef struct plot {
    char       *title, *name[2];
    int         log[2];             /* x, y                                             */
    double      lo[2], hi[2];       /* range; NAN: automatic                            */
    plot_line   line[PLOT_MAX_SERIES];
    plot_rule   rule[PLOT_MAX_RULES];
    int         nlines, nrules;
    const char *error;              /* the first one, a literal                         */
    FILE       *file;
    double      top, height;        /* of the data area, of the picture                 */
    plot_box   *box;                /* [nbox]                                           */
    int         nbox, cap;
} plot;

/* ===== building up a plot ================================================================ */

static inline char *plot_copy(const char *s) {
    size_t n = strlen(s ? s : "") + 1;
    char *p = (char *)malloc(n);
    if (p != NULL) memcpy(p, s ? s : "", n);
    return p;
}

static inline void plot_fail(plot *p, const char *error) {
    if (p->error == NULL) p->error = error;
}

static inline void plot_free(plot *p) {
    if (p == NULL) return;
    for (int i = 0; i < p->nlines; i++) {
        for (int j = 0; j < p->line[i].n; j++) free(p->line[i].p[j].label);
        free(p->line[i].p);
        free(p->line[i].name);
    }
    for (int i = 0; i < p->nrules; i++) free(p->rule[i].label);
    free(p->box);
    free(p->title);
    free(p->name[0]);
    free(p->name[1]);
    free(p);
}

/* A new plot, or NULL when there is no memory. Axis titles carry their units: "time (s)". */
static inline plot *plot_open(const char *title, const char *xname, const char *yname) {
    plot *p = (plot *)calloc(1, sizeof *p);
    if (p == NULL) return NULL;
    p->title = plot_copy(title);
    p->name[0] = plot_copy(xname);
    p->name[1] = plot_copy(yname);
    for (int a = 0; a < 2; a++) p->lo[a] = p->hi[a] = (double)NAN;
    if (p->title == NULL || p->name[0] == NULL || p->name[1] == NULL) {
        plot_free(p);
        return NULL;
    }
    return p;
}

/* Logarithmic axes where nonzero; linear by default. */
static inline void plot_axes(plot *p, int xlog, int ylog) {
    if (p == NULL) return;
    p->log[0] = xlog != 0;
    p->log[1] = ylog != 0;
}

/* Fixes the range of axis 0 (x) or 1 (y); NAN on one side leaves it automatic. */
static inline void plot_range(plot *p, int axis, double lo, double hi) {
    if (p == NULL || axis < 0 || axis > 1) return;
    p->lo[axis] = lo;
    p->hi[axis] = hi;
}

/* Adds a series; returns its number, -1 on error. */
static inline int plot_series(plot *p, const char *name) {
    if (p == NULL) return -1;
    if (p->nlines == PLOT_MAX_SERIES) {
        plot_fail(p, "plot_series: too many series");
        return -1;
    }
    plot_line *l = &p->line[p->nlines];
    l->name = plot_copy(name);
    if (l->name == NULL) {
        plot_fail(p, "out of memory");
        return -1;
    }
    return p->nlines++;
}

/* Adds a point to a series; label (NULL: none) is written beside its marker. */
static inline void plot_point(plot *p, int series, double x, double y, const char *label) {
    if (p == NULL || p->error != NULL) return;
    if (series < 0 || series >= p->nlines) {
        plot_fail(p, "plot_point: no such series");
        return;
    }
    plot_line *l = &p->line[series];
    if (l->n == l->cap) {
        int cap = l->cap < 16 ? 16 : 2 * l->cap;
        plot_mark *q = (plot_mark *)realloc(l->p, (size_t)cap * sizeof *q);
        if (q == NULL) {
            plot_fail(p, "out of memory");
            return;
        }
        l->p = q;
        l->cap = cap;
    }
    plot_mark *m = &l->p[l->n];
    m->x = x;
    m->y = y;
    m->label = label != NULL ? plot_copy(label) : NULL;
    if (label != NULL && m->label == NULL) plot_fail(p, "out of memory");
    l->n++;
}

/* Draws the least-squares slope of a series (in the axes' own scales) as a triangle. */
static inline void plot_fit(plot *p, int series) {
    if (p != NULL && series >= 0 && series < p->nlines) p->line[series].fit = 1;
}

static inline void plot_rule_add(plot *p, int vertical, double at, const char *label) {
    if (p == NULL) return;
    if (p->nrules == PLOT_MAX_RULES || !isfinite(at)) {
        plot_fail(p, "plot_hline, plot_vline: too many lines or a value that is not finite");
        return;
    }
    plot_rule *r = &p->rule[p->nrules];
    r->label = plot_copy(label);
    if (r->label == NULL) {
        plot_fail(p, "out of memory");
        return;
    }
    r->vertical = vertical;
    r->at = at;
    p->nrules++;
}

/* Reference lines with a label. */
static inline void plot_hline(plot *p, double y, const char *label) {
    plot_rule_add(p, 0, y, label);
}
static inline void plot_vline(plot *p, double x, const char *label) {
    plot_rule_add(p, 1, x, label);
}

/* ===== scales ============================================================================ */

static inline int plot_shows(const plot *p, int axis, double v) {
    return p->log[axis] ? isfinite(v) && v > 0 : fabs(v) <= 1e300;
}

static inline double plot_scale(const plot *p, int axis, double v) {
    return p->log[axis] ? log10(v) : v;
}

/* pixels of a value, or of one that is already on the axis' scale */
static inline double plot_px(const plot *p, int axis, double u) {
    double w = (u - p->lo[axis]) / (p->hi[axis] - p->lo[axis]);
    return axis == 0 ? PLOT_LEFT + w * (PLOT_WIDTH - PLOT_LEFT - PLOT_RIGHT)
                     : p->top + (1 - w) * PLOT_INNER;
}
static inline double plot_at(const plot *p, int axis, double v) {
    return plot_px(p, axis, plot_scale(p, axis, v));
}

/* 1, 2 or 5 times a power of ten, at least span / count */
static inline double plot_step(double span, int count) {
    double s = span / count, q = pow(10, floor(log10(s))), k = s / q;
    return q * (k > 5.000001 ? 10 : k > 2.000001 ? 5 : k > 1.000001 ? 2 : 1);
}

/* turns the ranges into ones on the axes' scales (log10 where logarithmic) with some air */
static inline void plot_ranges(plot *p) {
    for (int a = 0; a < 2; a++) {
        double lo = HUGE_VAL, hi = -HUGE_VAL;
        int fixed_lo = plot_shows(p, a, p->lo[a]), fixed_hi = plot_shows(p, a, p->hi[a]);
        for (int i = 0; i < p->nlines; i++) for (int j = 0; j < p->line[i].n; j++) {
            const plot_mark *m = &p->line[i].p[j];
            double v = a == 0 ? m->x : m->y;
            if (!plot_shows(p, a, v) || !plot_shows(p, 0, m->x)) continue;
            v = plot_scale(p, a, v);
            lo = v < lo ? v : lo;
            hi = v > hi ? v : hi;
        }
        for (int i = 0; i < p->nrules; i++) {
            if (p->rule[i].vertical != (a == 0) || !plot_shows(p, a, p->rule[i].at)) continue;
            double v = plot_scale(p, a, p->rule[i].at);
            lo = v < lo ? v : lo;
            hi = v > hi ? v : hi;
        }
        if (lo > hi) {
            lo = 0;
            hi = 1;
        }
        double span = hi - lo, least = p->log[a] ? 0.3 : 1e-9 * (fabs(hi) + fabs(lo)) + 1e-12;
        if (span < least) {
            lo -= span > 0 || p->log[a] ? 0.5 * least : 0.5 * fabs(lo) + 0.5;
            hi += span > 0 || p->log[a] ? 0.5 * least : 0.5 * fabs(hi) + 0.5;
            span = hi - lo;
        }
        double keep = lo;
        lo -= 0.06 * span;
        hi += 0.08 * span;
        if (!p->log[a] && keep >= 0 && (lo < 0 || keep < 0.35 * span)) lo = 0;
        p->lo[a] = fixed_lo ? plot_scale(p, a, p->lo[a]) : lo;
        p->hi[a] = fixed_hi ? plot_scale(p, a, p->hi[a]) : hi;
        if (!(p->lo[a] < p->hi[a])) p->hi[a] = p->lo[a] + 1;
    }
}

/* ===== writing =========================================================================== */

/* text with the three characters that XML reserves written as entities */
static inline void plot_text(plot *p, const char *s) {
    for (; *s != '\0'; s++) {
        if (*s == '&') fputs("&amp;", p->file);
        else if (*s == '<') fputs("&lt;", p->file);
        else if (*s == '>') fputs("&gt;", p->file);
        else if ((unsigned char)*s >= 32) fputc(*s, p->file);
    }
}

/* width of a text: characters (not UTF-8's continuation bytes) times 0.56 of the size */
static inline double plot_width(const char *s, double size) {
    int n = 0;
    for (; *s != '\0'; s++) n += ((unsigned char)*s & 0xC0) != 0x80;
    return 0.56 * size * n;
}

static inline void plot_put(plot *p, double x, double y, const char *anchor, const char *cls,
                            const char *text) {
    fprintf(p->file, "<text x='%.1f' y='%.1f' text-anchor='%s' class='%s'>", x, y, anchor, cls);
    plot_text(p, text);
    fputs("</text>\n", p->file);
}

static inline void plot_take(plot *p, double x0, double y0, double x1, double y1) {
    if (p->nbox == p->cap) {
        int cap = p->cap < 256 ? 256 : 2 * p->cap;
        plot_box *q = (plot_box *)realloc(p->box, (size_t)cap * sizeof *q);
        if (q == NULL) {
            plot_fail(p, "out of memory");
            return;
        }
        p->box = q;
        p->cap = cap;
    }
    plot_box b;
    b.x0 = x0;
    b.y0 = y0;
    b.x1 = x1;
    b.y1 = y1;
    p->box[p->nbox++] = b;
}

/* area of a box that is taken already, plus what sticks out of the data area (counted double) */
static inline double plot_clash(const plot *p, plot_box b) {
    double sum = 0;
    for (int i = 0; i < p->nbox; i++) {
        double w = fmin(b.x1, p->box[i].x1) - fmax(b.x0, p->box[i].x0);
        double h = fmin(b.y1, p->box[i].y1) - fmax(b.y0, p->box[i].y0);
        if (w > 0 && h > 0) sum += w * h;
    }
    sum += 40 * fmax(0, b.x1 - (PLOT_WIDTH - PLOT_RIGHT) + 3) + 40 * fmax(0, PLOT_LEFT + 2 - b.x0);
    return sum + 40 * fmax(0, p->top + 2 - b.y0) + 40 * fmax(0, b.y1 - p->top - PLOT_INNER + 2);
}

/* takes small boxes along a segment, so that labels stay off the lines */
static inline void plot_take_segment(plot *p, double x0, double y0, double x1, double y1) {
    int n = 1 + (int)(hypot(x1 - x0, y1 - y0) / 6);
    for (int i = 0; i <= n && n < 2000; i++) {
        double x = x0 + (x1 - x0) * i / n, y = y0 + (y1 - y0) * i / n;
        plot_take(p, x - 2, y - 2, x + 2, y + 2);
    }
}

/* the label of a marker at the best of sixteen places round it */
static inline void plot_label(plot *p, double x, double y, const char *text, int tone) {
    double w = plot_width(text, 11.5), least = HUGE_VAL;
    plot_box best = {0, 0, 0, 0};
    for (int i = 0; i < 16; i++) {
        double far = i < 8 ? 9 : 20, a = 0.785398163397448 * (i % 8) - 0.785398163397448;
        double cx = x + (far + 0.5 * w) * cos(a), cy = y - (far + 4) * sin(a);
        plot_box b;
        b.x0 = cx - 0.5 * w;
        b.x1 = cx + 0.5 * w;
        b.y0 = cy - 7;
        b.y1 = cy + 7;
        double cost = plot_clash(p, b) + 0.5 * i;
        if (cost < least) {
            least = cost;
            best = b;
        }
    }
    plot_take(p, best.x0, best.y0, best.x1, best.y1);
    fprintf(p->file, "<text x='%.1f' y='%.1f' class='knob t%d'>", best.x0, best.y1 - 3, tone);
    plot_text(p, text);
    fputs("</text>\n", p->file);
}

static inline void plot_marker(plot *p, int tone, double x, double y) {
    static const char *const shape[7] = {
        "M-4.5 0a4.5 4.5 0 1 0 9 0a4.5 4.5 0 1 0-9 0z", "M-4-4h8v8h-8z", "M0-5.4L5 3.6H-5z",
        "M0-5.6L5.6 0L0 5.6L-5.6 0z", "M0 5.4L5-3.6H-5z",
        "M-1.7-5h3.4v3.3h3.3v3.4h-3.3v3.3h-3.4v-3.3h-3.3v-3.4h3.3z",
        "M0-5.5L5.2-1.7L3.2 4.5H-3.2L-5.2-1.7z"};
    fprintf(p->file, "<path class='m%d' transform='translate(%.1f %.1f)' d='%s'/>\n", tone, x, y,
            shape[tone % 7]);
}

static inline void plot_head(plot *p) {
    static const char *const ink[2][7] = {
        {"#0072b2", "#c44f00", "#007a5a", "#a8447f", "#8a6500", "#3d94c9", "#4a4a4a"},
        {"#56a8e0", "#f08a3c", "#2fbf93", "#e08fc0", "#e6b332", "#9fd2f2", "#c9c9c9"}};
    FILE *f = p->file;
    fprintf(f, "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 %.0f %.0f' width='%.0f' "
               "height='%.0f' role='img' aria-label='", PLOT_WIDTH, p->height, PLOT_WIDTH,
            p->height);
    for (const char *s = p->title; *s != '\0'; s++) if (*s != '\'' && *s != '<' && *s != '&')
        fputc(*s, f);
    fputs("'>\n<style>\ntext{font-family:system-ui,'Segoe UI',Roboto,'Liberation Sans',sans-serif;"
          "font-size:12.5px}\n.title{font-size:16px;font-weight:600}\n.name{font-size:13.5px}\n"
          ".knob{font-size:11.5px}\n.line{fill:none;stroke-width:1.9;stroke-linejoin:round}\n"
          ".grid{fill:none;stroke-width:1}\n.fine{fill:none;stroke-width:.6}\n"
          ".rule{fill:none;stroke-width:1.3;stroke-dasharray:7 4}\n"
          ".tri{fill:none;stroke-width:1.2}\n.x{fill:none;stroke-width:2.2}\n", f);
    for (int d = 0; d < 2; d++) {
        if (d) fputs("@media(prefers-color-scheme:dark){\n", f);
        fprintf(f, ".bg{fill:%s}text{fill:%s}.soft,.tick{fill:%s}.grid{stroke:%s}.fine{stroke:%s}"
                   ".rule,.tri{stroke:%s}\n", d ? "#181b1f" : "#ffffff", d ? "#e6e8ea" : "#202428",
                d ? "#a6adb5" : "#565d65", d ? "#3a4048" : "#d4d7da", d ? "#2a2f35" : "#e9ebed",
                d ? "#a6adb5" : "#565d65");
        for (int i = 0; i < 7; i++)
            fprintf(f, ".s%d{stroke:%s}.m%d{fill:%s;stroke:%s;stroke-width:1}.t%d{fill:%s}\n", i,
                    ink[d][i], i, ink[d][i], d ? "#181b1f" : "#ffffff", i, ink[d][i]);
        if (d) fputs("}\n", f);
    }
    fputs("</style>\n", f);
    fprintf(f, "<rect class='bg' width='%.0f' height='%.0f'/>\n", PLOT_WIDTH, p->height);
    plot_put(p, 16, 27, "start", "title", p->title);
}

/* dashes repeat after seven series, when colours and markers do too */
static inline const char *plot_dash(int i) {
    return i < 7 ? "" : " stroke-dasharray='6 4'";
}

/* rows of the legend; draws nothing when measure is set. Returns the y below it. */
static inline double plot_legend(plot *p, int measure) {
    double x = 18, y = 50;
    for (int i = 0; i < p->nlines; i++) {
        double w = 42 + plot_width(p->line[i].name, 12.5) + 20;
        if (x > 18 && x + w > PLOT_WIDTH - 8) {
            x = 18;
            y += 20;
        }
        if (!measure) {
            fprintf(p->file, "<path class='line s%d' d='M%.1f %.1fh30'%s/>\n", i % 7, x, y - 4,
                    plot_dash(i));
            plot_marker(p, i % 7, x + 15, y - 4);
            plot_put(p, x + 38, y, "start", "name", p->line[i].name);
        }
        x += w;
    }
    return p->nlines > 0 ? y + 14 : 42;
}

/* a number on an axis: 10 to a power where zeros would pile up */
static inline void plot_tick(plot *p, int axis, double u, double step) {
    double v = p->log[axis] ? pow(10, u) : u, at = plot_px(p, axis, u);
    double x = axis == 0 ? at : PLOT_LEFT - 8, y = axis == 0 ? p->top + PLOT_INNER + 18 : at + 4;
    int e = p->log[axis] ? (int)floor(u + 0.5) : 0;
    fprintf(p->file, "<text x='%.1f' y='%.1f' text-anchor='%s' class='tick'>", x, y,
            axis == 0 ? "middle" : "end");
    if (p->log[axis] && fabs(u - e) < 1e-9 && (e < -3 || e > 4))
        fprintf(p->file, "10<tspan dy='-5' font-size='9'>%d</tspan></text>\n", e);
    else if (p->log[axis]) fprintf(p->file, "%.6g</text>\n", v);
    else fprintf(p->file, "%.6g</text>\n", fabs(v) < 1e-9 * step ? 0.0 : v);
}

static inline void plot_gridline(plot *p, int axis, double u, const char *cls) {
    double at = plot_px(p, axis, u);
    if (axis == 0)
        fprintf(p->file, "<path class='%s' d='M%.1f %.1fv%.1f'/>\n", cls, at, p->top, PLOT_INNER);
    else
        fprintf(p->file, "<path class='%s' d='M%.1f %.1fh%.1f'/>\n", cls, PLOT_LEFT, at,
                PLOT_WIDTH - PLOT_LEFT - PLOT_RIGHT);
}

static inline void plot_axis_log(plot *p, int a) {
    double lo = p->lo[a], hi = p->hi[a], span = hi - lo;
    int every = span > 18 ? 3 : span > 9 ? 2 : 1;
    for (int e = (int)floor(lo); e <= (int)ceil(hi); e++) for (int k = 1; k < 10; k++) {
        double u = e + log10((double)k);
        int named = span < 0.9 ? 1 : span < 2.2 ? k == 1 || k == 2 || k == 5 : k == 1;
        if (k == 1 && e % every != 0) named = 0;
        if (u < lo - 1e-9 || u > hi + 1e-9 || (!named && span > 6 && k > 1)) continue;
        plot_gridline(p, a, u, k == 1 ? "grid" : "fine");
        if (named) plot_tick(p, a, u, 1);
    }
}

static inline void plot_axes_draw(plot *p) {
    double mid = p->top + 0.5 * PLOT_INNER;
    for (int a = 0; a < 2; a++) {
        if (p->log[a]) {
            plot_axis_log(p, a);
            continue;
        }
        double step = plot_step(p->hi[a] - p->lo[a], a == 0 ? 8 : 7);
        for (double k = ceil(p->lo[a] / step - 1e-9); k * step <= p->hi[a] + 1e-9 * step; k++) {
            plot_gridline(p, a, k * step, "grid");
            plot_tick(p, a, k * step, step);
        }
    }
    fprintf(p->file, "<rect x='%.1f' y='%.1f' width='%.1f' height='%.1f' class='rule' "
                     "style='stroke-dasharray:none;stroke-width:1'/>\n",
            PLOT_LEFT, p->top, PLOT_WIDTH - PLOT_LEFT - PLOT_RIGHT, PLOT_INNER);
    plot_put(p, 0.5 * (PLOT_LEFT + PLOT_WIDTH - PLOT_RIGHT), p->top + PLOT_INNER + 42, "middle",
             "name", p->name[0]);
    fprintf(p->file, "<g transform='translate(20 %.1f) rotate(-90)'>", mid);
    plot_put(p, 0, 0, "middle", "name", p->name[1]);
    fputs("</g>\n", p->file);
}

static inline void plot_rules(plot *p) {
    for (int i = 0; i < p->nrules; i++) {
        const plot_rule *r = &p->rule[i];
        int a = r->vertical ? 0 : 1;
        if (!plot_shows(p, a, r->at)) continue;
        double u = plot_scale(p, a, r->at), at = plot_px(p, a, u), w = plot_width(r->label, 12.5);
        if (u < p->lo[a] || u > p->hi[a]) continue;
        plot_gridline(p, a, u, "rule");
        if (r->vertical) {
            int left = at + w + 8 > PLOT_WIDTH - PLOT_RIGHT;
            double x = left ? at - 6 : at + 6, y = p->top + 15;
            plot_put(p, x, y, left ? "end" : "start", "soft", r->label);
            plot_take(p, left ? x - w : x, y - 12, left ? x : x + w, y + 3);
            plot_take_segment(p, at, p->top, at, p->top + PLOT_INNER);
        } else {
            double x = PLOT_WIDTH - PLOT_RIGHT - 6, y = at < p->top + 20 ? at + 15 : at - 5;
            plot_put(p, x, y, "end", "soft", r->label);
            plot_take(p, x - w, y - 12, x, y + 3);
            plot_take_segment(p, PLOT_LEFT, at, x, at);
        }
    }
}

/* where point j of a series is drawn; 0: nowhere, 1: in place, 2: failed, at the top edge */
static inline int plot_spot(const plot *p, const plot_mark *m, double *x, double *y) {
    if (!plot_shows(p, 0, m->x)) return 0;
    *x = plot_at(p, 0, m->x);
    *y = p->top + 9;
    if (*x < PLOT_LEFT - 1 || *x > PLOT_WIDTH - PLOT_RIGHT + 1) return 0;
    if (!plot_shows(p, 1, m->y)) return 2;
    *y = plot_at(p, 1, m->y);
    return *y > p->top - 1 && *y < p->top + PLOT_INNER + 1;
}

static inline void plot_draw_line(plot *p, int i) {
    const plot_line *l = &p->line[i];
    double x, y, x1 = 0, y1 = 0;
    int pen = 0, open = 0;
    for (int j = 0; j < l->n; j++) {
        const plot_mark *m = &l->p[j];
        if (!plot_shows(p, 0, m->x) || !plot_shows(p, 1, m->y)) {
            pen = 0;
            continue;
        }
        x = plot_at(p, 0, m->x);
        y = plot_at(p, 1, m->y);
        if (!open) fprintf(p->file, "<path class='line s%d' clip-path='url(#c)'%s d='", i % 7,
                           plot_dash(i));
        open = 1;
        fprintf(p->file, "%c%.1f %.1f", pen ? 'L' : 'M', x, y);
        if (pen) plot_take_segment(p, x1, y1, x, y);
        x1 = x;
        y1 = y;
        pen = 1;
    }
    if (open) fputs("'/>\n", p->file);
}

static inline void plot_draw_marks(plot *p, int i) {
    const plot_line *l = &p->line[i];
    double x, y;
    int every = 1 + l->n / 24;
    for (int j = 0; j < l->n; j++) {
        int spot = plot_spot(p, &l->p[j], &x, &y);
        if (spot == 1 && j % every == every / 2) plot_marker(p, i % 7, x, y);
        else if (spot == 2)
            fprintf(p->file, "<path class='x s%d' d='M%.1f %.1fl10 10m0 -10l-10 10'/>\n", i % 7,
                    x - 5, y - 5);
        if (spot) plot_take(p, x - 6, y - 6, x + 6, y + 6);
    }
}

/* least squares on the axes' scales, drawn as a right triangle below the middle of the points */
static inline void plot_draw_fit(plot *p, int i) {
    const plot_line *l = &p->line[i];
    double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, lo = HUGE_VAL, hi = -HUGE_VAL;
    char text[48];
    for (int j = 0; j < l->n; j++) {
        const plot_mark *m = &l->p[j];
        if (!plot_shows(p, 0, m->x) || !plot_shows(p, 1, m->y)) continue;
        double u = plot_scale(p, 0, m->x), v = plot_scale(p, 1, m->y);
        n++;
        sx += u;
        sy += v;
        sxx += u * u;
        sxy += u * v;
        lo = u < lo ? u : lo;
        hi = u > hi ? u : hi;
    }
    double det = n * sxx - sx * sx, k = (n * sxy - sx * sy) / det;
    if (!l->fit || n < 2 || !(det > 0) || !isfinite(k)) return;
    double w = fmin(0.3 * (hi - lo), 0.16 * (p->hi[0] - p->lo[0])), least = HUGE_VAL, at[2];
    at[0] = at[1] = 0;
    snprintf(text, sizeof text, "slope %.2f", k);
    double tw = plot_width(text, 12.5);
    for (int c = 0; c < 28; c++) {
        double u = lo + (hi - lo - w) * (c % 7) / 6, side = c / 7 % 2 ? -1 : 1;
        double v = (sy - k * sx) / n + k * u;
        double px = plot_px(p, 0, u), py = plot_px(p, 1, v) + side * (c < 14 ? 26 : 44);
        double ex = plot_px(p, 0, u + w), ey = py + plot_px(p, 1, v + k * w) - plot_px(p, 1, v);
        plot_box b, t;
        b.x0 = px;
        b.x1 = ex;
        b.y0 = fmin(py, ey) - 2;
        b.y1 = fmax(py, ey) + 2;
        t.x0 = ex + 3;
        t.x1 = ex + 5 + tw;
        t.y0 = 0.5 * (py + ey) - 8;
        t.y1 = 0.5 * (py + ey) + 6;
        double cost = plot_clash(p, b) + 2 * plot_clash(p, t) + c / 7 * 20.0 + fabs(c % 7 - 3.0);
        if (cost < least) {
            least = cost;
            at[0] = u;
            at[1] = py;
        }
    }
    double px = plot_px(p, 0, at[0]), ex = plot_px(p, 0, at[0] + w);
    double ey = at[1] + plot_px(p, 1, k * w) - plot_px(p, 1, 0);
    fprintf(p->file, "<path class='tri' d='M%.1f %.1fL%.1f %.1fV%.1fz'/>\n", px, at[1], ex, ey,
            at[1]);
    fprintf(p->file, "<text x='%.1f' y='%.1f' class='knob t%d'>%s</text>\n", ex + 5,
            0.5 * (at[1] + ey) + 4, i % 7, text);
    plot_take(p, px, fmin(at[1], ey), ex, fmax(at[1], ey));
    plot_take(p, ex, 0.5 * (at[1] + ey) - 8, ex + 5 + tw, 0.5 * (at[1] + ey) + 6);
}

/* what the marks at the edges mean, where there are any */
static inline void plot_foot(plot *p) {
    int failed = 0, lost = 0;
    double x, y;
    char text[160];
    for (int i = 0; i < p->nlines; i++) for (int j = 0; j < p->line[i].n; j++) {
        int spot = plot_spot(p, &p->line[i].p[j], &x, &y);
        failed += spot == 2;
        lost += spot == 0;
    }
    if (failed + lost == 0) return;
    text[0] = '\0';
    if (failed) snprintf(text, sizeof text, "x at the top edge: failed or not finite (%d). ",
                         failed);
    size_t n = strlen(text);
    if (lost) snprintf(text + n, sizeof text - n, "%d points lie outside the chart.", lost);
    plot_put(p, 16, p->height - 10, "start", "knob soft", text);
}

static inline void plot_draw(plot *p) {
    double x, y;
    p->top = plot_legend(p, 1);
    p->height = p->top + PLOT_INNER + 76;
    plot_ranges(p);
    plot_head(p);
    plot_legend(p, 0);
    fprintf(p->file, "<clipPath id='c'><rect x='%.1f' y='%.1f' width='%.1f' height='%.1f'/>"
                     "</clipPath>\n", PLOT_LEFT, p->top, PLOT_WIDTH - PLOT_LEFT - PLOT_RIGHT,
            PLOT_INNER);
    plot_axes_draw(p);
    plot_rules(p);
    for (int i = 0; i < p->nlines; i++) plot_draw_line(p, i);
    for (int i = 0; i < p->nlines; i++) plot_draw_marks(p, i);
    for (int i = 0; i < p->nlines; i++) plot_draw_fit(p, i);
    for (int i = 0; i < p->nlines; i++) for (int j = 0; j < p->line[i].n; j++) {
        const plot_mark *m = &p->line[i].p[j];
        if (m->label != NULL && plot_spot(p, m, &x, &y)) plot_label(p, x, y, m->label, i % 7);
    }
    plot_foot(p);
    fputs("</svg>\n", p->file);
}

/* Writes the chart and frees the plot in every case. Returns NULL, or what went wrong as a
 * literal text; a file that was begun and could not be finished is left as it is. */
static inline const char *plot_close(plot *p, const char *path) {
    if (p == NULL) return "out of memory";
    const char *error = p->error;
    if (error == NULL) {
        p->file = fopen(path, "wb");
        if (p->file == NULL) error = "the file cannot be opened for writing";
        else {
            plot_draw(p);
            int bad = ferror(p->file);
            if (fclose(p->file) != 0) bad = 1;
            error = bad ? "writing the file failed; what is there is incomplete" : p->error;
        }
    }
    plot_free(p);
    return error;
}

#endif
