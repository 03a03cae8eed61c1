/* garments.c - garments on a body that walks and penetrates itself: no new intersection.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. stability/garments.c -lm
 * tier: default
 * By default the procedural shirt for 20 steps and one of the scanned garments of ../shared for 12;
 * FULL=1: the procedural shirt for 90, four garments of ../shared for 120, that is 2 s, the first
 * half second of which leads from the rest pose to the walk. SHOW_STEPS=1 prints every step;
 * PUSH_OUT=0.2 sets push_out, m/s.
 *
 * After each accepted step, by exact arithmetic, no two faces of the garment and no face of the
 * garment and one of the body may intersect that did not before. Faces of the body that were exempt
 * in the step are counted apart ('let in'): cloth that the body pinches may be passed by them; and
 * so are pairs beside one that intersected before ('spread'): where cloth was let in its crossing
 * wanders from face to face until it parts. 'most' is the largest number of pairs at any time. */
#define CLOTHSIM_IMPLEMENTATION
#include "../../clothsim_collide.h"

#include "../test.h"
#include "../exact.h"
#include "../body.h"
#include "../../examples/shapes.h"

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
    double        *x;                       /* all, for the examination                        */
    int           *all;                     /* [.. x 3] faces of the garment, then of the body */
    int           *pair, npair;             /* that intersect now                              */

    /* what came of it */
    int    steps, whole, shorter, failed, run, longest;     /* steps that failed in a row      */
    int    start, fresh, let_in, spread, inner, exempt;
    int    newton[STEPS_MOST], most;
    double ms[STEPS_MOST], total, contact, zones;
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

/* A pair that intersected before has both faces beside those of p: its crossing moved on. */
static int spreads(const walk *w, const int *p) {
    const int *f = w->all + 3 * p[0], *g = w->all + 3 * p[1];
    int        i;
    for (i = 0; i < w->npair; i++)
        if (share_corner(f, w->all + 3 * w->pair[2 * i]) &&
            share_corner(g, w->all + 3 * w->pair[2 * i + 1]))
            return 1;
    return 0;
}

/* Pairs that intersect now, two faces of the body left out; *fresh, *let_in: those that did not
 * before, with faces of the body that are an obstacle, that were exempt. */
static void examine(walk *w, int *fresh, int *let_in) {
    const int   cloth = w->desc.nf;
    exact_item *item;
    int        *found = NULL, n = 0, room = 0, i, j, a, b, d;
    memcpy(w->x, cloth_sim_state(w->sim)->x, 3 * (size_t)w->desc.nv * sizeof(double));
    memcpy(w->x + 3 * w->desc.nv, w->now, 3 * (size_t)w->nv * sizeof(double));
    item = exact_items(w->x, cloth + w->nf, w->all);
    a = exact_axis, b = (a + 1) % 3, d = (a + 2) % 3;
    *fresh = *let_in = w->inner = 0;
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
        if (p[1] >= cloth && w->c->off[p[1]]) ++*let_in;
        else if (spreads(w, p)) w->spread++;
        else ++*fresh;
    }
    free(w->pair);
    w->pair = found, w->npair = n;
    w->most = n > w->most ? n : w->most;
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
    contact.push_out = getenv("PUSH_OUT") ? strtod(getenv("PUSH_OUT"), NULL) : 0;
    w->nv = nv, w->nf = nf, w->faces = faces;
    w->now = (double *)malloc(3 * (size_t)nv * sizeof(double));
    w->next = (double *)malloc(3 * (size_t)nv * sizeof(double));
    w->x = (double *)malloc(3 * (size_t)(nv + desc->nv) * sizeof(double));
    w->all = (int *)malloc(3 * (size_t)(nf + desc->nf) * sizeof(int));
    if (!w->now || !w->next || !w->x || !w->all) exit(2);
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
    examine(w, &i, &ignored);
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
    free(w->all);
    free(w->pair);
}

/* The body goes to w->next in 1/60 s. */
static void walk_step(walk *w) {
    cloth_report         r;
    cloth_collide_report k;
    cloth_status         status;
    int                  i, fresh = 0, let_in = 0;
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
    w->contact += k.ms_begin + k.ms_detect + k.ms_zones;
    w->zones += k.ms_zones;
    if (status == CLOTH_OK) examine(w, &fresh, &let_in);
    w->fresh += fresh;
    w->let_in += let_in;
    if (getenv("SHOW_STEPS"))
        printf("  %3d st %d fr %g newton %d halv %d imp %d pass %d zones %d rows %d big %d "
               "rigid %d touch %d exempt %d push %.1e pairs %d self %d new %d let in %d ms %.0f "
               "begin %.0f det %.0f zone %.0f\n",
               w->steps, (int)status, k.fraction, r.newton, r.halvings, k.impacts, k.passes,
               k.zones, k.rows, k.largest_zone, k.rigid_zones, k.touches, k.exempt_faces, k.push,
               w->npair, w->inner, fresh, let_in, r.ms.total, k.ms_begin, k.ms_detect,
               k.ms_zones);
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
    printf("  %-14s %5s %5s %5s %5s %4s %6s %4s %6s %6s %5s %5s %9s %6s %11s %6s %6s\n", "garment",
           "nv", "steps", "whole", "short", "fail", "exempt", "new", "let in", "spread", "start",
           "most", "end(self)", "newton", "ms a step", "share", "zones");
    printf("  %-14s %5s %5s %5s %5s %4s %6s %4s %6s %6s %5s %5s %9s %6s %11s %6s %6s\n", "", "", "",
           "", "", "", "faces", "pairs", "pairs", "pairs", "pairs", "pairs", "pairs", "median",
           "median/max", "cont.", "share");
}

/* least: share of steps accepted, whole or shortened; fails: that may fail, no two in a row. */
static void walk_judge(walk *w, const char *name, double least, int fails) {
    const int n = w->steps;
    qsort(w->ms, (size_t)n, sizeof w->ms[0], order_doubles);
    qsort(w->newton, (size_t)n, sizeof w->newton[0], order_ints);
    printf("  %-14s %5d %5d %5d %5d %4d %6d %4d %6d %6d %5d %5d %4d(%3d) %6d %5.0f/%5.0f %6.2f "
           "%6.2f\n",
           name, w->desc.nv, n, w->whole, w->shorter, w->failed, w->exempt, w->fresh, w->let_in,
           w->spread, w->start, w->most, w->npair, w->inner, w->newton[n / 2], w->ms[n / 2],
           w->ms[n - 1], w->total > 0 ? w->contact / w->total : 0,
           w->total > 0 ? w->zones / w->total : 0);
    CHECK(w->fresh == 0);
    CHECK(w->whole + w->shorter >= least * n);
    CHECK(w->failed <= fails);
    CHECK(w->longest <= 1 && w->run == 0);
}

/* --- the procedural shirt on the procedural body --- */

static void shirt(void) {
    shapes_body  b;
    shapes_shirt s;
    walk         w;
    cloth_desc   desc = cloth_desc_default();
    const int    steps = test_full() ? 90 : 20;
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

static void skirt(void) {
    scanned("data/garments/skirt_f_clean.obj", "skirt", test_full() ? STEPS_MOST : 12, 0.99, 0);
}
static void long_skirt(void) {
    scanned("data/garments/longskirt_f_clean.obj", "long skirt", STEPS_MOST, 0.99, 0);
}
static void trousers(void) {
    scanned("data/garments/trousers_f_clean.obj", "trousers", STEPS_MOST, 0.99, 0);
}
static void tshirt(void) {
    scanned("data/garments/tshirt_f_clean.obj", "T-shirt", STEPS_MOST, 0.97, 3);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
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
