/* garments.c - garments on a body that walks and penetrates itself: no new intersection.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. stability/garments.c -lm
 * tier: default
 * By default the procedural shirt for 20 steps and one of the scanned garments of ../shared for 12;
 * FULL=1: the procedural shirt for 90, four garments of ../shared for 120, that is 2 s, the first
 * half second of which leads from the rest pose to the walk. SHOW_STEPS=1 prints every step;
 *
 * After each accepted step, by exact arithmetic, no two faces of the garment and no face of the
 * garment and one of the body may intersect that did not before. Counted apart are
 *   pinched  faces of the body in a pinch, exempt in the step: cloth that is held there may be
 *            passed by them; two faces of cloth all of whose corners are held: see 'self'
 *   leaving  the line in which the two cross now is of cloth that was inside of the body before the
 *            step, on the inner side of that face: what was held in comes out. Judged here, by the
 *            body's winding number at the same point of the cloth before, and not by the kit
 *   spread   pairs beside one that intersected before: where cloth was held its crossing wanders
 *            from face to face until it parts
 * What is left is new: cloth that went in. Every way in is counted as new or pinched, so that the
 * way out need not be. 'most' is the largest number of pairs at any time, 'clear' counts steps that
 * end without any.
 *
 * That a pair was exempt does not make it right. Of all that intersect, exempt or not, are open
 *   self     pairs of the garment with itself at any time: at most 100
 *   bare     crossings of garment and body outside of pinches, in every 6th step: none. The body's
 *            surface is in a pinch where it overlaps itself, by the winding number there, or where
 *            a face that looks the other way is nearer than 2 t and neither is beside the other
 *   parity   steps after which cloth_collide_intersections() is not what is counted here: none */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "../test.h"
#include "../exact.h"
#include "../edges.h"
#include "../body.h"
#include "../../examples/shapes.h"
#include "skeleton.h"

#define STEPS_MOST 120

typedef struct walk {
    cloth_desc     desc;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle id;
    int            nv, nf;                  /* of the body                                     */
    const int     *faces;                   /* of the body                                     */
    double        *now, *next;              /* [nv x 3] the body                               */
    double        *x, *before;              /* all, for the examination: now, before the step  */
    int           *all;                     /* [.. x 3] faces of the garment, then of the body */
    int           *pair, npair;             /* that intersect now                              */

    /* what came of it */
    int    steps, whole, shorter, failed, run, longest;     /* steps that failed in a row      */
    int    start, fresh, pinched, leaving, spread, inner, exempt;
    int    newton[STEPS_MOST], most;
    int    clear;                           /* steps that ended without a pair                 */
    int    self, bare, miscounted;          /* most pairs; most crossings; steps               */
    double ms[STEPS_MOST], total, contact, zones, stretch, speed;
} walk;

static double cpu_seconds(void *user) {
    (void)user;
    return (double)clock() / CLOCKS_PER_SEC;
}

static void print_error(cloth_log_level level, cloth_status status, const char *text,
                        void *user) {
    (void)user;
    (void)status;
    if (level == CLOTH_LOG_ERROR) printf("    %s\n", text);
}

static int same_pair(const void *a, const void *b) { return exact_order_pairs(a, b); }

static int share_corner(const int *f, const int *g) {
    int i;
    for (i = 0; i < 9; i++)
        if (f[i / 3] == g[i % 3]) return 1;
    return 0;
}

/* A pair that intersected before has both faces beside those of p: its crossing moved on. Two faces
 * of the garment are listed by number, so which is beside which is asked both ways. */
static int spreads(const walk *w, const int *p) {
    const int *f = w->all + 3 * p[0], *g = w->all + 3 * p[1];
    int        i;
    for (i = 0; i < w->npair; i++) {
        const int *d = w->all + 3 * w->pair[2 * i], *e = w->all + 3 * w->pair[2 * i + 1];
        if ((share_corner(f, d) && share_corner(g, e)) ||
            (share_corner(f, e) && share_corner(g, d)))
            return 1;
    }
    return 0;
}

/* Largest edge over its length at rest, and speed, m/s. */
static void extremes(walk *w) {
    const cloth_state *s = cloth_sim_state(w->sim);
    int                i, j;
    w->stretch = fmax(w->stretch, edges_longest(&w->desc, s->x));
    for (i = 0; i < w->desc.nv; i++) {
        double v = 0;
        for (j = 0; j < 3; j++) v += s->v[3 * i + j] * s->v[3 * i + j];
        w->speed = fmax(w->speed, sqrt(v));
    }
}

/* Winding number of faces [nf x 3], face `but` left out, around p, from the solid angle of each:
 * tan(angle/2) = det(a, b, c) / (|a||b||c| + a.b |c| + b.c |a| + c.a |b|)   [Van Oosterom and
 * Strackee 1983, doi 10.1109/TBME.1983.325207; Jacobson, Kavan and Sorkine-Hornung 2013,
 * doi 10.1145/2461912.2461916]. On a face that is left out: the mean of both its sides. */
static double winding(int nf, const int *faces, const double *x, int but, const double *p) {
    double sum = 0;
    int    f, i, j;
    for (f = 0; f < nf; f++) {
        double r[3][3], l[3], det, den;
        if (f == but) continue;
        for (i = 0; i < 3; i++) {
            for (j = 0; j < 3; j++) r[i][j] = x[3 * faces[3 * f + i] + j] - p[j];
            l[i] = sqrt(r[i][0] * r[i][0] + r[i][1] * r[i][1] + r[i][2] * r[i][2]);
        }
        det = r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1])
              + r[0][1] * (r[1][2] * r[2][0] - r[1][0] * r[2][2])
              + r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]);
        den = l[0] * l[1] * l[2];
        for (i = 0; i < 3; i++) {
            const double *a = r[i], *b = r[(i + 1) % 3];
            den += (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) * l[(i + 2) % 3];
        }
        sum += atan2(det, den);
    }
    return sum / (2 * 3.14159265358979323846);
}

/* Where the edges of triangle b [3 x 3] go through triangle a: points [at most 2 x 3]. */
static int pierced(const double a[3][3], const double b[3][3], int n, double point[2][3]) {
    double u[3], v[3], m[3];
    int    i, j;
    for (j = 0; j < 3; j++) u[j] = a[1][j] - a[0][j], v[j] = a[2][j] - a[0][j];
    for (j = 0; j < 3; j++)
        m[j] = u[(j + 1) % 3] * v[(j + 2) % 3] - u[(j + 2) % 3] * v[(j + 1) % 3];
    for (i = 0; i < 3 && n < 2; i++) {
        const double *p = b[i], *q = b[(i + 1) % 3];
        double        s = 0, t = 0, at[3], turn, lo = 1, hi = -1;
        int           k;
        for (j = 0; j < 3; j++) s += m[j] * (p[j] - a[0][j]), t += m[j] * (q[j] - a[0][j]);
        if (!((s < 0 && t >= 0) || (s >= 0 && t < 0))) continue;
        for (j = 0; j < 3; j++) at[j] = p[j] + s / (s - t) * (q[j] - p[j]);
        for (k = 0; k < 3; k++) {
            const double *e = a[k], *f = a[(k + 1) % 3];
            for (turn = 0, j = 0; j < 3; j++) {
                const int y = (j + 1) % 3, z = (j + 2) % 3;
                turn += m[j] * ((f[y] - e[y]) * (at[z] - e[z]) - (f[z] - e[z]) * (at[y] - e[y]));
            }
            lo = turn < lo ? turn : lo;
            hi = turn > hi ? turn : hi;
        }
        if (lo < 0 && hi > 0) continue;
        memcpy(point[n++], at, sizeof at);
    }
    return n;
}

/* The point of triangle `to` at the weights that p has in the plane of triangle `from`. */
static void same_point(const double from[3][3], const double to[3][3], const double *p,
                       double *out) {
    double u[3], v[3], r[3], uu = 0, uv = 0, vv = 0, ur = 0, vr = 0, d, b, c;
    int    j;
    for (j = 0; j < 3; j++) {
        u[j] = from[1][j] - from[0][j], v[j] = from[2][j] - from[0][j], r[j] = p[j] - from[0][j];
        uu += u[j] * u[j], uv += u[j] * v[j], vv += v[j] * v[j];
        ur += u[j] * r[j], vr += v[j] * r[j];
    }
    d = uu * vv - uv * uv;
    b = (vv * ur - uv * vr) / d, c = (uu * vr - uv * ur) / d;
    for (j = 0; j < 3; j++)
        out[j] = to[0][j] + b * (to[1][j] - to[0][j]) + c * (to[2][j] - to[0][j]);
}

/* The line in which face g of the cloth crosses face f of a body of faces [nf x 3] at x is of cloth
 * that was on the inner side of f or deeper at `before`: three points of it are asked. f itself is
 * no part of the number now, which is the mean of its sides then, a half. */
static int leaves(int nf, const int *faces, const double *x, const double *before, const int *g,
                  int f) {
    double a[3][3], b[3][3], old[3][3], end[2][3], p[3], was[3];
    int    i, j, n;
    for (i = 0; i < 3; i++) {
        memcpy(a[i], x + 3 * g[i], sizeof a[i]);
        memcpy(old[i], before + 3 * g[i], sizeof old[i]);
        memcpy(b[i], x + 3 * faces[3 * f + i], sizeof b[i]);
    }
    n = pierced((const double(*)[3])b, (const double(*)[3])a, 0, end);
    n = pierced((const double(*)[3])a, (const double(*)[3])b, n, end);
    if (n < 2) return 0;
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++)
            p[j] = end[0][j] + (0.05 + 0.45 * i) * (end[1][j] - end[0][j]);
        same_point((const double(*)[3])a, (const double(*)[3])old, p, was);
        if (!(winding(nf, faces, before, -1, was) > winding(nf, faces, x, f, p) + 0.25)) return 0;
    }
    return 1;
}

/* All corners of both faces of the cloth are held in a pinch. */
static int all_held(const walk *w, const int *p) {
    int i, k;
    for (i = 0; i < 6; i++) {
        const int v = w->all[3 * p[i / 3] + i % 3];
        for (k = 0; k < w->c->nhold && w->c->hold[k].vertex != v; k++) {}
        if (k == w->c->nhold) return 0;
    }
    return 1;
}

/* Pairs that intersect now, two faces of the body left out; *fresh, *pinched: those that did not
 * before, with faces of the body that are an obstacle, that were exempt. */
static void examine(walk *w, int *fresh, int *pinched) {
    const int   cloth = w->desc.nf;
    exact_item *item;
    int        *found = NULL, n = 0, room = 0, i, j, a, b, d;
    memcpy(w->x, cloth_sim_state(w->sim)->x, 3 * (size_t)w->desc.nv * sizeof(double));
    memcpy(w->x + 3 * w->desc.nv, w->now, 3 * (size_t)w->nv * sizeof(double));
    item = exact_items(w->x, cloth + w->nf, w->all);
    a = exact_axis, b = (a + 1) % 3, d = (a + 2) % 3;
    *fresh = *pinched = w->inner = 0;
    for (i = 0; i < cloth + w->nf; i++)
        for (j = i + 1; j < cloth + w->nf && item[j].lo[a] <= item[i].hi[a]; j++) {
            const exact_item *p = item + i, *q = item + j;
            int               f = p->face < q->face ? p->face : q->face, g = p->face + q->face - f;
            if (f >= cloth || q->lo[b] > p->hi[b] || p->lo[b] > q->hi[b] ||
                q->lo[d] > p->hi[d] || p->lo[d] > q->hi[d] ||
                !exact_triangles(w->x, w->all + 3 * f, w->all + 3 * g))
                continue;
            if (n == room) {
                room = 2 * room + 64;
                found = (int *)realloc(found, 2 * (size_t)room * sizeof *found);
                if (!found) exit(2);
            }
            found[2 * n] = f, found[2 * n++ + 1] = g;
            w->inner += g < cloth;
        }
    free(item);
    if (n) qsort(found, (size_t)n, 2 * sizeof *found, exact_order_pairs);
    for (i = 0; i < n; i++) {
        const int *p = found + 2 * i;
        if (w->npair && bsearch(p, w->pair, (size_t)w->npair, 2 * sizeof *p, same_pair)) continue;
        if (p[1] < cloth ? all_held(w, p) : w->c->nhold > 0 && w->c->pinched[p[1]]) ++*pinched;
        else if (p[1] >= cloth && leaves(w->nf, w->all + 3 * cloth, w->x, w->before,
                                         w->all + 3 * p[0], p[1] - cloth))
            w->leaving++;
        else if (spreads(w, p)) w->spread++;
        else ++*fresh;
    }
    free(w->pair);
    w->pair = found, w->npair = n;
    w->most = n > w->most ? n : w->most;
}

/* --- what is a pinch --- */

static void normal_of(const double *x, const int *f, double *m) {
    double u[3], v[3];
    int    j;
    for (j = 0; j < 3; j++) u[j] = x[3 * f[1] + j] - x[3 * f[0] + j];
    for (j = 0; j < 3; j++) v[j] = x[3 * f[2] + j] - x[3 * f[0] + j];
    for (j = 0; j < 3; j++)
        m[j] = u[(j + 1) % 3] * v[(j + 2) % 3] - u[(j + 2) % 3] * v[(j + 1) % 3];
}

/* A point of face g of the body looks at p, a point of face f, from nearer than `range`, and the
 * two do not share a corner. */
static int faced(int nf, const int *faces, const double *x, int f, const double *p, double range) {
    double own[3], other[3];
    int    g, j;
    normal_of(x, faces + 3 * f, own);
    for (g = 0; g < nf; g++) {
        const int *c = faces + 3 * g;
        double     turn = 0;
        if (share_corner(faces + 3 * f, c)) continue;
        normal_of(x, c, other);
        for (j = 0; j < 3; j++) turn += own[j] * other[j];
        if (turn < 0 && skeleton_distance(x + 3 * c[0], x + 3 * c[1], x + 3 * c[2], p) < range)
            return 1;
    }
    return 0;
}

/* The crossing of face g of the cloth with face f of a body lies where the body is alone: with f
 * left out the winding number on f is 1/2 where nothing overlaps, 3/2 and more where two do. */
static int is_bare(int nf, const int *faces, const double *x, const int *g, int f, double range) {
    double a[3][3], b[3][3], end[2][3], p[3];
    int    i, n;
    for (i = 0; i < 3; i++) {
        memcpy(a[i], x + 3 * g[i], sizeof a[i]);
        memcpy(b[i], x + 3 * faces[3 * f + i], sizeof b[i]);
    }
    n = pierced((const double(*)[3])b, (const double(*)[3])a, 0, end);
    n = pierced((const double(*)[3])a, (const double(*)[3])b, n, end);
    if (n < 2) return 0;
    for (i = 0; i < 3; i++) p[i] = 0.5 * (end[0][i] + end[1][i]);
    return winding(nf, faces, x, f, p) < 1 && !faced(nf, faces, x, f, p, range);
}

/* Crossings outside of pinches now: of at most 200 pairs, which stand for all. */
static int count_bare(const walk *w) {
    const int cloth = w->desc.nf, stride = w->npair / 200 + 1;
    int       i, n = 0;
    for (i = 0; i < w->npair; i += stride) {
        const int *p = w->pair + 2 * i;
        if (p[1] < cloth) continue;
        n += is_bare(w->nf, w->all + 3 * cloth, w->x, w->all + 3 * p[0], p[1] - cloth,
                     2 * cloth_collide_desc_default().thickness);
    }
    return n * stride;
}

/* After a step that was accepted, when the pairs are known. */
static void count_all(walk *w) {
    int n = -1;
    w->self = w->inner > w->self ? w->inner : w->self;
    CHECK(cloth_collide_intersections(w->c, 0, NULL, &n) == CLOTH_OK);
    w->miscounted += n != w->npair;
    if (w->steps % 6) return;
    n = count_bare(w);
    w->bare = n > w->bare ? n : w->bare;
}

/* desc: nv, nf, faces, x_rest and X are set; x: pose of the body at the start. */
static int walk_start(walk *w, const cloth_desc *desc, int nv, int nf, const int *faces,
                      const double *x) {
    cloth_collide_desc  contact = cloth_collide_desc_default();
    cloth_obstacle_desc self = cloth_obstacle_desc_default();
    int                 i, ignored;
    memset(w, 0, sizeof *w);
    w->desc = *desc;
    w->desc.hooks.clock.fn = cpu_seconds;
    w->desc.hooks.log.fn = print_error;
    w->desc.material = cloth_material_fabric(CLOTH_FABRIC_COTTON_KNIT);
    w->desc.contact = CLOTH_CONTACT_SELF;
    contact.initial = CLOTH_INITIAL_EXEMPT;
    w->nv = nv, w->nf = nf, w->faces = faces;
    w->now = (double *)malloc(3 * (size_t)nv * sizeof(double));
    w->next = (double *)malloc(3 * (size_t)nv * sizeof(double));
    w->x = (double *)malloc(3 * (size_t)(nv + desc->nv) * sizeof(double));
    w->before = (double *)malloc(3 * (size_t)(nv + desc->nv) * sizeof(double));
    w->all = (int *)malloc(3 * (size_t)(nf + desc->nf) * sizeof(int));
    if (!w->now || !w->next || !w->x || !w->before || !w->all) exit(2);
    memcpy(w->now, x, 3 * (size_t)nv * sizeof(double));
    memcpy(w->all, desc->faces, 3 * (size_t)desc->nf * sizeof(int));
    for (i = 0; i < 3 * nf; i++) w->all[3 * desc->nf + i] = desc->nv + faces[i];
    CHECK(cloth_model_create(&w->desc, &w->model) == CLOTH_OK);
    if (w->model) CHECK(cloth_sim_create(w->model, &w->sim) == CLOTH_OK);
    if (w->sim) CHECK(cloth_collide_create(w->sim, &contact, &w->c) == CLOTH_OK);
    if (!w->c) return 0;
    self.nv = nv, self.nf = nf, self.faces = faces, self.x = x;
    self.self_penetrating = 1;
    if (!CHECK(cloth_collide_add(w->c, &self, &w->id) == CLOTH_OK)) return 0;
    memcpy(w->before, desc->x_rest, 3 * (size_t)desc->nv * sizeof(double));
    memcpy(w->before + 3 * desc->nv, x, 3 * (size_t)nv * sizeof(double));
    examine(w, &i, &ignored);
    w->leaving = w->spread = 0;
    w->start = w->npair;
    return 1;
}

static void walk_end(walk *w) {
    cloth_collide_destroy(w->c);
    cloth_sim_destroy(w->sim);
    cloth_model_destroy(w->model);
    free(w->now);
    free(w->next);
    free(w->x);
    free(w->before);
    free(w->all);
    free(w->pair);
}

/* The body goes to w->next in 1/60 s. */
static void walk_step(walk *w) {
    cloth_report         r;
    cloth_collide_report k;
    cloth_status         status;
    int                  i, fresh = 0, pinched = 0, leaving, spread;
    memcpy(w->before, cloth_sim_state(w->sim)->x, 3 * (size_t)w->desc.nv * sizeof(double));
    memcpy(w->before + 3 * w->desc.nv, w->now, 3 * (size_t)w->nv * sizeof(double));
    (void)cloth_collide_move(w->c, w->id, w->next);
    status = cloth_collide_step(w->c, 1.0 / 60, 3, &r);
    k = cloth_collide_last(w->c);
    for (i = 0; status == CLOTH_OK && i < 3 * w->nv; i++)
        w->now[i] = k.fraction < 1 ? w->now[i] + k.fraction * (w->next[i] - w->now[i])
                                   : w->next[i];
    w->whole += status == CLOTH_OK && k.fraction >= 1;
    w->shorter += status == CLOTH_OK && k.fraction < 1;
    w->failed += status != CLOTH_OK;
    w->run = status == CLOTH_OK ? 0 : w->run + 1;
    w->longest = w->run > w->longest ? w->run : w->longest;
    w->exempt = k.exempt_faces > w->exempt ? k.exempt_faces : w->exempt;
    w->newton[w->steps] = r.newton;
    w->ms[w->steps++] = r.ms.total;
    w->total += r.ms.total;
    w->contact += r.ms.contact;
    w->zones += k.ms_zones;
    leaving = w->leaving, spread = w->spread;
    if (status == CLOTH_OK) examine(w, &fresh, &pinched);
    if (status == CLOTH_OK) count_all(w);
    if (status == CLOTH_OK) extremes(w);
    w->clear += w->npair == 0;
    w->fresh += fresh;
    w->pinched += pinched;
    if (getenv("SHOW_STEPS"))
        printf("  %3d st %d fr %g newton %d halv %d imp %d pass %d zones %d rows %d big %d "
               "rigid %d touch %d exempt %d push %.1e pairs %d self %d new %d pinched %d leave %d "
               "spread %d ms %.0f "
               "begin %.0f det %.0f zone %.0f\n",
               w->steps, (int)status, k.fraction, r.newton, r.halvings, k.impacts, k.passes,
               k.zones, k.rows, k.largest_zone, k.rigid_zones, k.contacts, k.exempt_faces, k.push,
               w->npair, w->inner, fresh, pinched, w->leaving - leaving,
               w->spread - spread, r.ms.total, k.ms_begin, k.ms_detect, k.ms_zones);
    fflush(stdout);
}

static int order_doubles(const void *a, const void *b) {
    const double p = *(const double *)a, q = *(const double *)b;
    return (p > q) - (p < q);
}

static int order_ints(const void *a, const void *b) {
    const int p = *(const int *)a, q = *(const int *)b;
    return (p > q) - (p < q);
}

static void walk_title(void) {
    printf("  %-14s %5s %5s %5s %5s %4s %6s %4s %6s %6s %6s %5s %5s %9s %5s %6s %11s %6s %6s %7s "
           "%5s\n", "garment", "nv", "steps", "whole", "short", "fail", "exempt", "new", "pinch",
           "leave", "spread", "start", "most", "end(self)", "clear", "newton", "ms a step", "share",
           "zones", "stretch", "speed");
    printf("  %-14s %5s %5s %5s %5s %4s %6s %4s %6s %6s %6s %5s %5s %9s %5s %6s %11s %6s %6s %7s "
           "%5s\n", "", "", "", "", "", "", "faces", "pairs", "pairs", "pairs", "pairs", "pairs",
           "pairs", "pairs", "steps", "median", "median/max", "cont.", "share", "", "m/s");
}

/* least: share of steps accepted, whole or shortened; fails: that may fail, no two in a row. */
static void walk_judge(walk *w, const char *name, double least, int fails) {
    const int n = w->steps;
    qsort(w->ms, (size_t)n, sizeof w->ms[0], order_doubles);
    qsort(w->newton, (size_t)n, sizeof w->newton[0], order_ints);
    printf("  %-14s %5d %5d %5d %5d %4d %6d %4d %6d %6d %6d %5d %5d %4d(%3d) %5d %6d "
           "%5.0f/%5.0f %6.2f %6.2f %7.2f %5.1f\n",
           name, w->desc.nv, n, w->whole, w->shorter, w->failed, w->exempt, w->fresh, w->pinched,
           w->leaving, w->spread, w->start, w->most, w->npair, w->inner, w->clear,
           w->newton[n / 2], w->ms[n / 2],
           w->ms[n - 1], w->total > 0 ? w->contact / w->total : 0,
           w->total > 0 ? w->zones / w->total : 0, w->stretch, w->speed);
    printf("  %-14s self %d, bare %d pairs at most; %d steps miscounted\n", "", w->self, w->bare,
           w->miscounted);
    CHECK(w->fresh == 0);
    OPEN_MOST(w->self, 100, "pairs of the garment with itself");
    OPEN_MOST(w->bare, 0, "crossings of garment and body outside of pinches");
    OPEN_MOST(w->miscounted, 0, "steps whose crossings the kit counts otherwise");
    OPEN_MOST(w->stretch, 2.5, "longest edge over its length");
    CHECK(w->whole + w->shorter >= least * n);
    CHECK(w->failed <= fails);
    CHECK(w->longest <= 1 && w->run == 0);
}

/* --- what is counted as leaving --- */

/* A tetrahedron and a triangle that cuts its face x = 0 between y = 0.2 and 0.5: after going deeper
 * that is new, after coming out it leaves; so it is with the tetrahedron inside of a larger one. */
static void criterion(void) {
    static const int faces[24] = {0, 2, 1, 0, 3, 2, 0, 1, 3, 1, 2, 3, 4, 6, 5, 4, 7, 6, 4, 5, 7,
                                  5, 6, 7};
    static const int cloth[3] = {8, 9, 10};
    static const double at[33] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, -1, -1, -1, 9, -1, -1,
                                  -1, 9, -1, -1, -1, 9, 0.1, 0.3, 0.2, -0.3, 0.2, 0.2, -0.3, 0.5,
                                  0.2};
    double now[33], in[33], out[33];
    int    i, nf;
    memcpy(now, at, sizeof now);
    memcpy(in, at, sizeof in);
    memcpy(out, at, sizeof out);
    for (i = 24; i < 33; i += 3) in[i] += 0.35, out[i] -= 0.35;
    for (nf = 4; nf <= 8; nf += 4) {
        CHECK_NEAR(winding(nf, faces, at, -1, at + 24), nf / 4, 1e-12);
        CHECK_NEAR(winding(nf, faces, at, -1, at + 27), nf / 4 - 1, 1e-12);
        CHECK(leaves(nf, faces, now, in, cloth, 1));
        CHECK(!leaves(nf, faces, now, out, cloth, 1));
        CHECK(!leaves(nf, faces, now, now, cloth, 3));      /* does not cross */
        CHECK(is_bare(nf, faces, now, cloth, 1, 1e-3) == (nf == 4));    /* inside of the larger */
        CHECK(!is_bare(nf, faces, now, cloth, 3, 1e-3));
    }
}

/* --- the procedural shirt on the procedural body --- */

static void shirt(void) {
    shapes_body  b;
    shapes_shirt s;
    walk         w;
    cloth_desc   desc = cloth_desc_default();
    const int    steps = test_full() ? 90 : 12;
    double      *x;
    const char  *error = shapes_body_make(0.029, &b);
    int          i;
    if (!error) error = shapes_shirt_make(0.024, &s);
    CHECK(error == NULL);
    if (error) return;
    desc.nv = s.nv, desc.nf = s.nf, desc.faces = s.faces;
    desc.X = s.X, desc.x_rest = s.x, desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    x = (double *)malloc(3 * (size_t)b.nv * sizeof(double));
    if (!x) exit(2);
    shapes_body_walk(&b, 0.0, 0.0, x);
    if (walk_start(&w, &desc, b.nv, b.nf, b.faces, x)) {
        for (i = 1; i <= steps; i++) {
            shapes_body_walk(&b, i / 60.0, 0.0, w.next);
            walk_step(&w);
        }
        walk_judge(&w, "formula shirt", 0.99, 0);
    }
    walk_end(&w);
    free(x);
    shapes_shirt_free(&s);
    shapes_body_free(&b);
}

/* --- the scanned ones --- */

static void scanned(const char *file, const char *name, int steps, double least, int fails) {
    cloth_mesh *m = NULL;
    cloth_desc  desc = cloth_desc_default();
    body        b;
    walk        w;
    double     *x;
    int         i;
    if (!body_load(&b)) SKIP("no ../shared/data/body");
    if (cloth_obj_load(NULL, test_shared(file), NULL, &m) != CLOTH_OK) {
        body_free(&b);
        SKIP("no such garment in ../shared");
    }
    desc.nv = m->nv, desc.nf = m->nf, desc.faces = m->faces, desc.x_rest = m->x;
    x = (double *)malloc(3 * (size_t)b.mesh->nv * sizeof(double));
    if (!x) exit(2);
    body_pose(&b, 0, x);
    if (walk_start(&w, &desc, b.mesh->nv, b.mesh->nf, b.mesh->faces, x)) {
        for (i = 1; i <= steps; i++) {      /* captured at 120 Hz */
            body_pose(&b, 2 * i, w.next);
            walk_step(&w);
        }
        walk_judge(&w, name, least, fails);
    }
    walk_end(&w);
    free(x);
    cloth_mesh_destroy(NULL, m);
    body_free(&b);
}

static int steps_most(void) {
    const int n = getenv("STEPS") ? atoi(getenv("STEPS")) : STEPS_MOST;
    return n > 0 && n < STEPS_MOST ? n : STEPS_MOST;
}

static void skirt(void) {
    scanned("data/garments/skirt_f_clean.obj", "skirt", test_full() ? steps_most() : 8, 0.99, 0);
}
static void long_skirt(void) {
    scanned("data/garments/longskirt_f_clean.obj", "long skirt", steps_most(), 0.99, 0);
}
static void trousers(void) {
    scanned("data/garments/trousers_f_clean.obj", "trousers", steps_most(), 0.99, 0);
}
static void tshirt(void) {
    scanned("data/garments/tshirt_f_clean.obj", "T-shirt", steps_most(), 0.97, 3);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(criterion);
    walk_title();
    RUN(shirt);
    RUN(skirt);
    if (test_full()) {
        RUN(long_skirt);
        RUN(trousers);
        RUN(tshirt);
    }
    return TEST_END();
}
