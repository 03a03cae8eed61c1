/* test_tree.c - the hierarchy of boxes against brute force: pairs, refit, box query, nearest item,
 * candidate pairs of features; workers and range orders; a failing allocator.   tier: quick
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_tree.c -o test_tree -lm && ./test_tree */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "test.h"
#include "host.h"

/* --- random numbers and boxes --- */

static unsigned long long seed = 1;

static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) / 9007199254740992.0;
}

static int below(int n) { return (int)(uniform() * n); }

typedef enum kind { SMALL, LARGE, POINTS, LATTICE, SAME, FLAT, HUGE_RANGE, BROKEN, KINDS } kind;

/* Boxes that are easy, that overlap all over, that touch in exact equality, that have no extent,
 * that floats cannot hold, that are NaN or unbounded. */
static void make_boxes(kind how, int n, double *box) {
    int i, k;
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++) {
            double at = uniform(), size = 0.1 * uniform();
            switch (how) {
            case LARGE: size = uniform(); break;
            case POINTS: at = below(4); size = 0; break;
            case LATTICE: at = 0.1 * below(8); size = 0.1 * below(3); break;
            case SAME: at = 0.3; size = 0.1; break;
            case FLAT: size = k == i % 3 ? 0 : size; break;
            case HUGE_RANGE: at = ldexp(at, below(600) - 300); size = ldexp(size, below(600) - 300);
                break;
            case BROKEN:
                if (below(20) == 0) at = NAN;
                if (below(20) == 0) size = INFINITY;
                break;
            default: break;
            }
            box[6 * i + k] = at;
            box[6 * i + 3 + k] = at + size;
        }
}

/* Independent of the kit's: an interval per axis, touching counts, NaN is unbounded. */
static int overlap(const double *a, const double *b) {
    int k;
    for (k = 0; k < 3; k++)
        if (a[3 + k] < b[k] || b[3 + k] < a[k]) return 0;
    return 1;
}

/* --- lists of pairs --- */

static void pair_look(int a, int b, const void *ctx, clothi_segment *out) {
    (void)ctx;
    clothi_segment_put(out, a, b);
}

static cloth_status cross_pairs(const cloth_hooks *hooks, const clothi_bvh *a, const clothi_bvh *b,
                                const unsigned char *sought, clothi_pairs *pairs) {
    return clothi_bvh_look(hooks, a, b, sought, pair_look, NULL, pairs);
}

/* vf and ee [both->count]: those of vertices and faces, and those of edges, in their order. */
static cloth_status features_pairs(const cloth_hooks *hooks, const clothi_features_job *job,
                                   const clothi_bvh *tree, clothi_pairs *both, clothi_pairs *vf,
                                   clothi_pairs *ee) {
    cloth_status status = clothi_bvh_look(hooks, tree, tree, NULL, clothi_features_look, job, both);
    int          i;
    clothi_pairs_free(NULL, vf);
    clothi_pairs_free(NULL, ee);
    vf->pair = (int *)clothi_alloc(NULL, 2 * (size_t)both->count, sizeof(int));
    ee->pair = (int *)clothi_alloc(NULL, 2 * (size_t)both->count, sizeof(int));
    if (!vf->pair || !ee->pair) exit(1);
    for (i = 0; i < both->count; i++) {
        const int *p = both->pair + 2 * i;
        int       *q = p[0] < 0 ? ee->pair + 2 * ee->count++ : vf->pair + 2 * vf->count++;
        q[0] = p[0] < 0 ? ~p[0] : p[0];
        q[1] = p[0] < 0 ? ~p[1] : p[1];
    }
    return status;
}

static int compare_pairs(const void *a, const void *b) {
    const int *p = (const int *)a, *q = (const int *)b;
    return p[0] != q[0] ? (p[0] < q[0] ? -1 : 1) : p[1] != q[1] ? (p[1] < q[1] ? -1 : 1) : 0;
}

/* A sorted copy, to be freed. */
static int *sorted(const int *pair, int count) {
    int *copy = (int *)malloc(((size_t)count + 1u) * 2 * sizeof *copy);
    if (!copy) exit(1);
    if (count) memcpy(copy, pair, (size_t)count * 2 * sizeof *copy);
    qsort(copy, (size_t)count, 2 * sizeof *copy, compare_pairs);
    return copy;
}

static int has_pair(const int *sorted_pairs, int count, int a, int b) {
    int key[2];
    key[0] = a;
    key[1] = b;
    return count && bsearch(key, sorted_pairs, (size_t)count, sizeof key, compare_pairs) != NULL;
}

/* Counts what brute force finds; every one must be in the list, and the list no longer. sought [na]
 * (NULL: all): pairs with one of a that is. */
static int same_pairs(int na, const double *a, const unsigned char *sought, int nb, const double *b,
                      int first_b, int self, const clothi_pairs *pairs) {
    int *list = sorted(pairs->pair, pairs->count), i, j, count = 0, missing = 0;
    for (i = 0; i < na; i++)
        for (j = self ? i + 1 : 0; j < nb; j++)
            if (overlap(a + 6 * i, b + 6 * j) &&
                (!sought || sought[i] || (self && sought[j]))) {
                count++;
                missing += !has_pair(list, pairs->count, i, first_b + j);
            }
    free(list);
    return missing == 0 && count == pairs->count;
}

/* --- pairs --- */

static const int sizes[] = {0, 1, 2, 3, 4, 5, 8, 9, 17, 64, 65, 130, 300};
#define NSIZES ((int)(sizeof sizes / sizeof *sizes))
#define MAX_N 300

static void pairs_equal_brute_force(void) {
    static double box_a[6 * MAX_N], box_b[6 * MAX_N];
    clothi_bvh    a, b;
    clothi_pairs  pairs;
    unsigned char some[MAX_N];
    int           how, i, j, round;
    memset(&pairs, 0, sizeof pairs);
    for (i = 0; i < MAX_N; i++) some[i] = (unsigned char)(below(3) == 0);
    for (how = 0; how < KINDS; how++)
        for (i = 0; i < NSIZES; i++) {
            const int na = sizes[i];
            make_boxes((kind)how, na, box_a);
            if (!CHECK(clothi_bvh_build(NULL, na, box_a, &a) == CLOTH_OK)) return;
            for (round = 0; round < 2; round++) {       /* as built, and refitted to other boxes */
                const unsigned char *sought = round ? some : NULL;
                CHECK(cross_pairs(NULL, &a, &a, sought, &pairs) == CLOTH_OK);
                CHECK(same_pairs(na, box_a, sought, na, box_a, 0, 1, &pairs));
                for (j = i % 2; j < NSIZES; j += 2) {
                    const int nb = sizes[j];
                    make_boxes((kind)((how + round) % KINDS), nb, box_b);
                    if (!CHECK(clothi_bvh_build(NULL, nb, box_b, &b) == CLOTH_OK)) return;
                    b.first = 1000;
                    CHECK(cross_pairs(NULL, &a, &b, sought, &pairs) == CLOTH_OK);
                    CHECK(same_pairs(na, box_a, sought, nb, box_b, 1000, 0, &pairs));
                    clothi_bvh_free(NULL, &b);
                }
                make_boxes((kind)((how + 1) % KINDS), na, box_a);
                clothi_bvh_refit(NULL, &a, box_a);
            }
            clothi_bvh_free(NULL, &a);
        }
    clothi_pairs_free(NULL, &pairs);
}

/* Two boxes that touch, or miss by one unit in the last place. */
static void last_digit(void) {
    clothi_bvh   t;
    clothi_pairs pairs;
    int          i, k, wrong = 0;
    memset(&pairs, 0, sizeof pairs);
    for (i = 0; i < 3000; i++) {
        double box[12], edge = ldexp(uniform() - 0.5, below(250) - 125);
        int    axis = below(3), flip = 6 * below(2), gap;
        for (gap = 0; gap < 2; gap++) {
            for (k = 0; k < 12; k++) box[k] = k % 6 < 3 ? -1e60 : 1e60;
            box[flip + 3 + axis] = edge;
            box[6 - flip + axis] = gap ? nextafter(edge, 1e300) : edge;
            if (clothi_bvh_build(NULL, 2, box, &t) != CLOTH_OK) return;
            if (cross_pairs(NULL, &t, &t, NULL, &pairs) != CLOTH_OK) return;
            wrong += pairs.count != !gap;
            clothi_bvh_free(NULL, &t);
        }
    }
    CHECK(wrong == 0);
    clothi_pairs_free(NULL, &pairs);
}

/* Every node holds its items' boxes, every item is in one leaf, leaves are as small as promised. */
static void nodes_contain_their_items(void) {
    static double box[6 * MAX_N];
    clothi_bvh    t;
    int           how, i, k, level, bad = 0, seen[MAX_N];
    for (how = 0; how < KINDS; how++) {
        const int n = MAX_N - how;
        make_boxes((kind)how, n, box);
        if (!CHECK(clothi_bvh_build(NULL, n, box, &t) == CLOTH_OK)) return;
        memset(seen, 0, sizeof seen);
        for (i = 0; i < n; i++) seen[t.item[i]]++;
        for (i = 0; i < n; i++) bad += seen[i] != 1;
        for (level = 0; level <= t.depth; level++)
            for (i = 0; i < n; i++) {
                int           j = 0;
                const double *node;
                while (clothi_bvh_item(&t, j + 1, level) <= i) j++;
                node = t.node + 6 * ((1 << level) + j);
                for (k = 0; k < 3; k++) {
                    const double lo = box[6 * t.item[i] + k], hi = box[6 * t.item[i] + 3 + k];
                    bad += node[k] > lo || node[3 + k] < hi;
                    bad += (lo != lo || hi != hi) && node[3 + k] - node[k] < 1e300;
                }
                if (level == t.depth)
                    bad += clothi_bvh_item(&t, j + 1, level) - clothi_bvh_item(&t, j, level) > 4;
            }
        clothi_bvh_free(NULL, &t);
    }
    CHECK(bad == 0);
}

/* --- queries --- */

typedef struct asked {
    const double *box, *side;
} asked;

/* Of a box; with a side, of its centre, which is to be there. */
static double box_distance2(int item, const double *p, const void *ctx) {
    const asked  *a = (const asked *)ctx;
    const double *b = a->box + 6 * (item - 7);
    double        d2 = 0, beyond = 0;
    int           k;
    for (k = 0; k < 3; k++) {
        const double c = 0.5 * (b[k] + b[3 + k]) - p[k];
        const double d = a->side ? c : fmax(fmax(b[k] - p[k], p[k] - b[3 + k]), 0);
        if (a->side) beyond += a->side[k] * c;
        d2 += d * d;
    }
    return !a->side || beyond > 0 ? d2 : HUGE_VAL;
}

static void walk_and_nearest(void) {
    static double box[6 * MAX_N];
    clothi_bvh    t;
    int           how, i, k, q, bad = 0, bad_near = 0;
    for (how = 0; how < KINDS - 1; how++)               /* distances to NaN mean nothing */
        for (q = 0; q < 400; q++) {
            const int   n = 1 + (q * 37) % MAX_N;
            double      ask[6], p[3], side[3], best = HUGE_VAL, d2 = q % 2 ? 1e300 : 0.05;
            const asked from = {box, q % 3 ? NULL : side};
            int         met[MAX_N] = {0}, nearest = -1, found;
            clothi_bvh_walk w;
            if (q % 40 == 0) seed += 11;
            make_boxes((kind)how, n, box);
            if (!CHECK(clothi_bvh_build(NULL, n, box, &t) == CLOTH_OK)) return;
            t.first = 7;
            make_boxes((kind)how, 1, ask);
            w.tree = &t, w.box = ask, w.node = 1, w.at = w.end = 0;
            while ((found = clothi_bvh_next(&w)) >= 0) met[found - 7]++;
            for (i = 0; i < n; i++) bad += met[i] != overlap(ask, box + 6 * i);
            for (k = 0; k < 3; k++) p[k] = 3 * uniform() - 1, side[k] = uniform() - 0.5;
            for (i = 0; i < n; i++) {
                const double d = box_distance2(i + 7, p, &from);
                if (d <= d2 && d < best) {
                    best = d;
                    nearest = i + 7;
                }
            }
            found = clothi_bvh_nearest(&t, p, from.side, box_distance2, &from, &d2);
            bad_near += found != nearest || (found >= 0 && fabs(d2 - best) > 0);
            clothi_bvh_free(NULL, &t);
        }
    CHECK(bad == 0);
    CHECK(bad_near == 0);
}

/* --- features --- */

/* Two thirds of a soup, one third an open fan: many faces at a vertex and at an edge. */
static void make_mesh(int nv, int nf, double *xa, double *xb, int *faces) {
    int i, k;
    for (i = 0; i < 3 * nv; i++) {
        xa[i] = uniform();
        xb[i] = xa[i] + 0.1 * uniform();
    }
    for (i = 0; i < nf; i++) {
        int *f = faces + 3 * i;
        f[0] = i % 3 ? below(nv) : 0;
        do f[1] = i % 6 ? below(nv) : 1;
        while (f[1] == f[0]);
        do f[2] = below(nv);
        while (f[2] == f[0] || f[2] == f[1]);
        for (k = 1; k < 3; k++)                         /* small faces: corners near the first */
            if (f[k] > 1) {
                xa[3 * f[k]] = xa[3 * f[0]] + 0.1 * uniform();
                xb[3 * f[k]] = xa[3 * f[k]];
            }
    }
}

/* The swept, padded box of up to three vertices; pads in plain arithmetic. */
static void feature_box(int n, const int *v, const double *xa, const double *xb, double pad,
                        double *box) {
    int i, k;
    for (k = 0; k < 3; k++) {
        box[k] = HUGE_VAL;
        box[3 + k] = -HUGE_VAL;
        for (i = 0; i < n; i++) {
            box[k] = fmin(box[k], fmin(xa[3 * v[i] + k], xb[3 * v[i] + k]));
            box[3 + k] = fmax(box[3 + k], fmax(xa[3 * v[i] + k], xb[3 * v[i] + k]));
        }
        box[k] -= pad;
        box[3 + k] += pad;
    }
}

static int in_face(const int *f, int v) { return f[0] == v || f[1] == v || f[2] == v; }

typedef struct scene {
    int             nv, nf;
    double         *xa, *xb, *vbox, *fbox;
    int            *faces;
    clothi_features features;
    clothi_bvh      tree;
    clothi_pairs    pairs, both, vf, ee;
} scene;

static void scene_free(scene *s) {
    clothi_free(NULL, s->features.edges);
    clothi_bvh_free(NULL, &s->tree);
    clothi_pairs_free(NULL, &s->pairs);
    clothi_pairs_free(NULL, &s->both);
    clothi_pairs_free(NULL, &s->vf);
    clothi_pairs_free(NULL, &s->ee);
    free(s->xa);
    free(s->xb);
    free(s->vbox);
    free(s->fbox);
    free(s->faces);
    memset(s, 0, sizeof *s);
}

static void scene_alloc(scene *s, int nv, int nf) {
    memset(s, 0, sizeof *s);
    s->nv = nv;
    s->nf = nf;
    s->xa = (double *)calloc(3 * (size_t)nv, sizeof(double));
    s->xb = (double *)calloc(3 * (size_t)nv, sizeof(double));
    s->vbox = (double *)calloc(6 * (size_t)nv, sizeof(double));
    s->fbox = (double *)calloc(6 * (size_t)nf, sizeof(double));
    s->faces = (int *)calloc(3 * (size_t)nf, sizeof(int));
    if (!s->xa || !s->xb || !s->vbox || !s->fbox || !s->faces) exit(1);
}

static cloth_status scene_find(scene *s, const cloth_hooks *hooks, double pad) {
    const clothi_features_job job = {&s->features, s->vbox, s->fbox};
    cloth_status              status;
    if (!s->features.faces) {
        status = clothi_features_build(hooks, s->nv, s->nf, s->faces, &s->features);
        if (status) return status;
    }
    clothi_swept_boxes(s->nv, s->xa, s->xb, pad, s->vbox);
    clothi_face_boxes(s->nf, s->faces, s->vbox, s->fbox);
    if (!s->tree.n) status = clothi_bvh_build(hooks, s->nf, s->fbox, &s->tree);
    else clothi_bvh_refit(hooks, &s->tree, s->fbox), status = CLOTH_OK;
    if (!status) status = cross_pairs(hooks, &s->tree, &s->tree, NULL, &s->pairs);
    if (!status)
        status = features_pairs(hooks, &job, &s->tree, &s->both, &s->vf, &s->ee);
    return status;
}

/* --- brute force over boxes sorted by their left ends: all pairs that overlap, in any order --- */

static const double *sweep_box;

static int compare_left(const void *a, const void *b) {
    const double p = sweep_box[6 * *(const int *)a], q = sweep_box[6 * *(const int *)b];
    return p < q ? -1 : p > q ? 1 : 0;
}

/* order [n] the boxes with left ends increasing; *wide the widest extent along x. */
static void sweep_sort(int n, const double *box, int *order, double *wide) {
    int i;
    *wide = 0;
    for (i = 0; i < n; i++) {
        order[i] = i;
        *wide = fmax(*wide, box[6 * i + 3] - box[6 * i]);
    }
    sweep_box = box;
    qsort(order, (size_t)n, sizeof *order, compare_left);
}

/* The first of order whose left end is at least x. */
static int sweep_from(int n, const double *box, const int *order, double x) {
    int from = 0, to = n;
    while (from < to) {
        const int mid = (from + to) / 2;
        if (box[6 * order[mid]] < x) from = mid + 1;
        else to = mid;
    }
    return from;
}

/* --- every vertex that has a face against every face, every edge against every edge --- */

static void check_vf(scene *s, double pad) {
    int           *list = sorted(s->vf.pair, s->vf.count), i, j, n = 0, bad = 0;
    int           *order = (int *)malloc((size_t)s->nf * sizeof *order);
    double        *box = (double *)malloc(6 * (size_t)s->nf * sizeof *box), wide;
    unsigned char *used = (unsigned char *)calloc((size_t)s->nv, 1);
    if (!used || !box || !order) exit(1);
    for (i = 0; i < 3 * s->nf; i++) used[s->faces[i]] = 1;
    for (i = 0; i < s->nf; i++) feature_box(3, s->faces + 3 * i, s->xa, s->xb, pad, box + 6 * i);
    sweep_sort(s->nf, box, order, &wide);
    for (i = 0; i < s->nv; i++) {
        double a[6];
        feature_box(1, &i, s->xa, s->xb, pad, a);
        j = sweep_from(s->nf, box, order, a[0] - 1.001 * wide);
        for (; used[i] && j < s->nf && box[6 * order[j]] <= a[3]; j++) {
            if (!overlap(a, box + 6 * order[j]) || in_face(s->faces + 3 * order[j], i)) continue;
            n++;
            bad += !has_pair(list, s->vf.count, i, order[j]);
        }
    }
    CHECK(bad == 0);
    CHECK(n == s->vf.count);
    free(list);
    free(used);
    free(box);
    free(order);
}

static void check_ee(scene *s, double pad) {
    const int    ne = s->features.ne, *e = s->features.edges;
    int         *list = sorted(s->ee.pair, s->ee.count), i, j, n = 0, bad = 0;
    int         *order = (int *)malloc((size_t)ne * sizeof *order);
    double      *box = (double *)malloc(6 * (size_t)ne * sizeof *box), wide;
    if (!box || !order) exit(1);
    for (i = 0; i < ne; i++) feature_box(2, e + 2 * i, s->xa, s->xb, pad, box + 6 * i);
    sweep_sort(ne, box, order, &wide);
    for (i = 0; i < ne; i++)
        for (j = i + 1; j < ne && box[6 * order[j]] <= box[6 * order[i] + 3]; j++) {
            const int p = order[i] < order[j] ? order[i] : order[j];
            const int q = order[i] < order[j] ? order[j] : order[i];
            if (!overlap(box + 6 * p, box + 6 * q) || e[2 * p] == e[2 * q] ||
                e[2 * p] == e[2 * q + 1] || e[2 * p + 1] == e[2 * q] ||
                e[2 * p + 1] == e[2 * q + 1])
                continue;
            n++;
            bad += !has_pair(list, s->ee.count, p, q);
        }
    CHECK(bad == 0);
    CHECK(n == s->ee.count);
    free(list);
    free(box);
    free(order);
}

static void features_equal_brute_force(void) {
    int round;
    for (round = 0; round < 6; round++) {
        scene     s;
        const int nv = 5 + 40 * round, nf = 8 + 60 * round;
        scene_alloc(&s, nv, nf);
        make_mesh(nv, nf, s.xa, s.xb, s.faces);
        CHECK(scene_find(&s, NULL, 0) == CLOTH_OK);
        check_vf(&s, 0);
        check_ee(&s, 0);
        CHECK(scene_find(&s, NULL, 1.0 / 32) == CLOTH_OK);
        check_vf(&s, 1.0 / 32);
        check_ee(&s, 1.0 / 32);
        scene_free(&s);
    }
}

/* Points at D from each other, pads that add up to D but for rounding: the boxes touch. */
static void pads_are_outward(void) {
    int i, missed = 0;
    for (i = 0; i < 40000; i++) {
        const double d = ldexp(uniform(), below(40) - 40), pad = uniform() * d;
        double       a[3] = {0}, b[3] = {0}, box_a[6], box_b[6];
        a[i % 3] = i % 2 ? ldexp(uniform() - 0.5, below(20)) : 0;
        b[i % 3] = a[i % 3] + d;
        if (b[i % 3] - a[i % 3] > d) b[i % 3] = nextafter(b[i % 3], -HUGE_VAL);
        clothi_swept_boxes(1, a, NULL, pad, box_a);
        clothi_swept_boxes(1, b, NULL, d - pad, box_b);
        missed += !clothi_boxes_meet(box_a, box_b);
    }
    CHECK(missed == 0);
}

static void features_refuse(void) {
    const int       out[3] = {0, 1, 3}, twice[3] = {0, 1, 1};
    clothi_features f;
    CHECK(clothi_features_build(NULL, 3, 1, out, &f) == CLOTH_ERR_MESH);
    CHECK(clothi_features_build(NULL, 3, 1, twice, &f) == CLOTH_ERR_MESH);
    CHECK(clothi_features_build(NULL, 3, -1, out, &f) == CLOTH_ERR_ARGUMENT);
    CHECK(f.edges == NULL);
}

/* Nothing near anything: no pair of faces, no task. */
static void nothing_to_find(void) {
    scene s;
    scene_alloc(&s, 0, 0);
    CHECK(scene_find(&s, NULL, 0.1) == CLOTH_OK);
    CHECK(s.pairs.count == 0 && s.vf.count == 0 && s.ee.count == 0);
    scene_free(&s);
    scene_alloc(&s, 3, 1);
    s.faces[1] = 1, s.faces[2] = 2;
    CHECK(scene_find(&s, NULL, 0.1) == CLOTH_OK);
    CHECK(s.pairs.count == 0 && s.vf.count == 0 && s.ee.count == 0);
    scene_free(&s);
}

/* --- the public steps with known collisions --- */

static int read_step(const char *name, scene *s, int **pairs, unsigned *nvf, unsigned *nee) {
    char     path[128], magic[8];
    unsigned head[4], counts[2];
    size_t   i, half;
    FILE    *f;
    snprintf(path, sizeof path, "data/ccd/meshes/%s.meshpair", name);
    f = fopen(test_shared(path), "rb");
    if (!f) return 0;
    if (fread(magic, 1, 8, f) != 8 || fread(head, 4, 4, f) != 4) exit(1);
    scene_alloc(s, (int)head[0], (int)head[1]);
    for (half = 0; half < 2; half++)
        for (i = 0; i < 3 * (size_t)head[0]; i++) {
            float  single;
            double number;
            if (head[2] == 4) {
                if (fread(&single, 4, 1, f) != 1) exit(1);
                number = (double)single;
            } else if (fread(&number, 8, 1, f) != 1) exit(1);
            (half ? s->xb : s->xa)[i] = number;
        }
    if (fread(s->faces, 12, head[1], f) != head[1]) exit(1);
    fclose(f);
    snprintf(path, sizeof path, "data/ccd/meshes/%s.pairs", name);
    f = fopen(test_shared(path), "rb");
    if (!f || fread(magic, 1, 8, f) != 8 || fread(counts, 4, 2, f) != 2) exit(1);
    *nvf = counts[0];
    *nee = counts[1];
    *pairs = (int *)malloc(20 * (size_t)(*nvf + *nee));
    if (!*pairs || fread(*pairs, 20, *nvf + *nee, f) != *nvf + *nee) exit(1);
    fclose(f);
    return 1;
}

static int edge_number(const clothi_features *f, int a, int b) {
    const int lo = a < b ? a : b, hi = a < b ? b : a;
    int       from = 0, to = f->ne;
    while (from < to) {
        const int mid = (from + to) / 2, *e = f->edges + 2 * mid;
        if (e[0] < lo || (e[0] == lo && e[1] < hi)) from = mid + 1;
        else to = mid;
    }
    return from;
}

static int check_step(const char *name, double pad) {
    scene    s;
    int     *list, *vf, *ee, i, listed = 0, missing = 0, missing_true = 0;
    unsigned nvf, nee;
    if (!read_step(name, &s, &list, &nvf, &nee)) return 0;
    CHECK(scene_find(&s, NULL, pad) == CLOTH_OK);
    vf = sorted(s.vf.pair, s.vf.count);
    ee = sorted(s.ee.pair, s.ee.count);
    for (i = 0; i < (int)(nvf + nee); i++) {
        const int *p = list + 5 * i;
        int        in;
        if (i < (int)nvf) {
            if (in_face(s.faces + 3 * p[1], p[0])) continue;
            in = has_pair(vf, s.vf.count, p[0], p[1]);
        } else {
            int a = edge_number(&s.features, p[0], p[1]), b = edge_number(&s.features, p[2], p[3]);
            if (p[0] == p[2] || p[0] == p[3] || p[1] == p[2] || p[1] == p[3]) continue;
            in = has_pair(ee, s.ee.count, a < b ? a : b, a < b ? b : a);
        }
        listed++;
        missing += !in;
        missing_true += !in && p[4];
    }
    CHECK(missing_true == 0);
    printf("  %s: %d faces, %d pairs of faces; %d vf + %d ee; %d listed by its authors, %d of them "
           "not here, %d of those collide\n", name, s.nf, s.pairs.count, s.vf.count, s.ee.count,
           listed, missing, missing_true);
    if (!test_quick() && (s.nf < 20000 || test_full())) {
        check_vf(&s, pad);
        check_ee(&s, pad);
    }
    free(vf);
    free(ee);
    free(list);
    scene_free(&s);
    return 1;
}

static void public_steps(void) {
    const int a = check_step("cloth-funnel", 0), b = check_step("armadillo-rollers", 0);
    if (!a && !b) SKIP("no ../../shared/data/ccd/meshes");
}

/* --- workers --- */

typedef struct player {
    int how, workers, calls;                /* how 0 forward, 1 reversed, 2 one by one inwards */
} player;

static void play(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    player *p = (player *)user;
    int     n = (count + grain - 1) / grain, i;
    for (i = 0; i < n; i++) {
        const int at = p->how == 0 ? i : p->how == 1 ? n - 1 - i : i % 2 ? n - 1 - i / 2 : i / 2;
        const int end = (at + 1) * grain < count ? (at + 1) * grain : count;
        fn(at * grain, end, i % p->workers, ctx);
    }
    p->calls++;
}

static int same_list(const clothi_pairs *a, const clothi_pairs *b) {
    return a->count == b->count && a->count > 0 &&
           memcmp(a->pair, b->pair, (size_t)a->count * 2 * sizeof(int)) == 0;
}

static void workers_do_not_matter(void) {
    scene         serial, other;
    cloth_hooks   hooks;
    player        p;
    clothi_pairs  cross;
    const int     nv = 400, nf = 600;
    memset(&hooks, 0, sizeof hooks);
    memset(&p, 0, sizeof p);
    memset(&cross, 0, sizeof cross);
    hooks.parallel.run = play;
    hooks.parallel.user = &p;
    scene_alloc(&serial, nv, nf);
    make_mesh(nv, nf, serial.xa, serial.xb, serial.faces);
    CHECK(scene_find(&serial, NULL, 0.01) == CLOTH_OK);
    CHECK(cross_pairs(NULL, &serial.tree, &serial.tree, NULL, &cross) == CLOTH_OK);
    for (p.workers = 1; p.workers <= 16; p.workers++) {
        clothi_pairs again;
        memset(&again, 0, sizeof again);
        hooks.parallel.max_workers = p.workers;
        p.how = p.workers % 3;
        scene_alloc(&other, nv, nf);
        memcpy(other.xa, serial.xa, 3 * (size_t)nv * sizeof(double));
        memcpy(other.xb, serial.xb, 3 * (size_t)nv * sizeof(double));
        memcpy(other.faces, serial.faces, 3 * (size_t)nf * sizeof(int));
        CHECK(scene_find(&other, &hooks, 0.01) == CLOTH_OK);
        CHECK(scene_find(&other, &hooks, 0.01) == CLOTH_OK);
        CHECK(same_list(&serial.pairs, &other.pairs));
        CHECK(same_list(&serial.vf, &other.vf));
        CHECK(same_list(&serial.ee, &other.ee));
        CHECK(cross_pairs(&hooks, &other.tree, &other.tree, NULL, &again) == CLOTH_OK);
        CHECK(same_list(&cross, &again));
        clothi_pairs_free(NULL, &again);
        scene_free(&other);
    }
    CHECK(p.calls > 0);
    clothi_pairs_free(NULL, &cross);
    scene_free(&serial);
}

/* --- memory --- */

static void allocator_fails(void) {
    int fail, done = 0;
    for (fail = 1; fail < 60 && !done; fail++) {
        scene        s;
        host         h;
        cloth_hooks  hooks = host_hooks(&h);
        cloth_status status;
        h.fail_at = fail;
        seed = 5;
        scene_alloc(&s, 100, 200);
        make_mesh(100, 200, s.xa, s.xb, s.faces);
        status = scene_find(&s, &hooks, 0.05);
        CHECK(status == CLOTH_OK || (status == CLOTH_ERR_MEMORY && h.errors == 1));
        CHECK(status == CLOTH_OK || s.both.count == 0);
        done = status == CLOTH_OK;
        if (done) {                         /* the same again takes no memory */
            const int calls = h.calls;
            CHECK(scene_find(&s, &hooks, 0.05) == CLOTH_OK);
            CHECK(h.calls == calls);
        }
        clothi_free(&hooks, s.features.edges);
        s.features.edges = NULL;
        clothi_bvh_free(&hooks, &s.tree);
        clothi_pairs_free(&hooks, &s.pairs);
        clothi_pairs_free(&hooks, &s.both);
        CHECK(h.live == 0);
        scene_free(&s);
    }
    CHECK(done);
    CHECK(fail > 8);                        /* sort 2, features, tree, scratch 2, lists 2 */
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(pairs_equal_brute_force);
    RUN(last_digit);
    RUN(nodes_contain_their_items);
    RUN(walk_and_nearest);
    RUN(pads_are_outward);
    RUN(features_equal_brute_force);
    RUN(features_refuse);
    RUN(nothing_to_find);
    RUN(public_steps);
    RUN(workers_do_not_matter);
    RUN(allocator_fails);
    return TEST_END();
}
