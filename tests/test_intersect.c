/* test_intersect.c - intersecting triangles, decided by exact signs, against rational arithmetic:
 * cases made by hand, random ones that touch, lie in one plane or have no area, shared meshes;
 * workers and range orders; refusals; a failing allocator.                          tier: quick
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_intersect.c -o test_intersect -lm \
 *      && ./test_intersect */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "test.h"
#include "host.h"
#include "exact.h"

/* --- cases with an answer that a drawing gives --- */

typedef struct drawing {
    const char *name;
    int         answer;
    double      x[18];                      /* corners of f, then those of g that are its own  */
    int         g[3];
} drawing;

static const drawing drawings[] = {
    {"through the middle", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,-1, 1,1,1, 2,1,3}, {3, 4, 5}},
    {"beside it", 0,
     {0,0,0, 4,0,0, 0,4,0, 3,3,-1, 3,3,1, 9,9,0}, {3, 4, 5}},
    {"above it", 0,
     {0,0,0, 4,0,0, 0,4,0, 1,1,1, 2,1,1, 1,2,2}, {3, 4, 5}},
    {"a corner touches the face", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,0, 2,1,1, 1,2,2}, {3, 4, 5}},
    {"a corner touches an edge", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,0,0, 2,1,1, 1,2,2}, {3, 4, 5}},
    {"a corner touches a corner", 1,
     {0,0,0, 4,0,0, 0,4,0, 4,0,0, 5,1,1, 5,2,2}, {3, 4, 5}},
    {"edges cross", 1,
     {0,0,0, 4,0,0, 0,4,0, 2,0,-1, 2,0,1, 2,-5,0}, {3, 4, 5}},
    {"in one plane, apart", 0,
     {0,0,0, 4,0,0, 0,4,0, 3,3,0, 5,3,0, 3,5,0}, {3, 4, 5}},
    {"in one plane, over each other", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,0, 5,1,0, 1,5,0}, {3, 4, 5}},
    {"in one plane, one within the other", 1,
     {0,0,0, 8,0,0, 0,8,0, 1,1,0, 2,1,0, 1,2,0}, {3, 4, 5}},
    {"in one plane, edges touch", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,0,0, 3,0,0, 2,-2,0}, {3, 4, 5}},
    {"in one plane, a corner touches", 1,
     {0,0,0, 4,0,0, 0,4,0, 2,2,0, 5,2,0, 2,5,0}, {3, 4, 5}},
    {"parallel planes", 0,
     {0,0,0, 4,0,0, 0,4,0, 0,0,1, 4,0,1, 0,4,1}, {3, 4, 5}},
    {"neighbours at an edge, open", 0, {0,0,0, 4,0,0, 0,4,0, 0,-4,1, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"neighbours at an edge, flat", 0, {0,0,0, 4,0,0, 0,4,0, 0,-4,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"neighbours at an edge, shut", 1, {0,0,0, 4,0,0, 0,4,0, 1,4,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"neighbours at an edge, nearly shut", 0,
     {0,0,0, 4,0,0, 0,4,0, 1,4,1e-300, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"neighbours at an edge, the third corners in one place", 1,
     {0,0,0, 4,0,0, 0,4,0, 0,4,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"twins", 0, {0,0,0, 4,0,0, 0,4,0, 0,0,0, 0,0,0, 0,0,0}, {1, 0, 2}},
    {"a common vertex only", 0,
     {0,0,0, 4,0,0, 0,4,0, -1,0,0, -1,-1,0, 0,0,0}, {0, 3, 4}},
    {"a common vertex, in one plane, over each other", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,0, 1,2,0, 0,0,0}, {0, 3, 4}},
    {"a common vertex, in one plane, along an edge", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,0,0, 1,-2,0, 0,0,0}, {0, 3, 4}},
    {"a common vertex, one within the angle of the other", 1,
     {0,0,0, 4,0,0, 0,4,0, 9,8,0, 8,9,0, 0,0,0}, {0, 3, 4}},
    {"a common vertex, through the face", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,1, 1,1,-1, 0,0,0}, {0, 3, 4}},
    {"a common vertex, an edge in the face", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,0, 1,1,-1, 0,0,0}, {0, 3, 4}},
    {"a common vertex, the side opposite outside", 1,
     {0,0,0, 4,0,0, 0,4,0, 9,9,9, 9,9,-9, 0,0,0}, {0, 3, 4}},
    {"a common vertex, on the other side of it", 0,
     {0,0,0, 4,0,0, 0,4,0, -1,-1,1, -1,-1,-1, 0,0,0}, {0, 3, 4}},
    {"no area: a segment through the face", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,-1, 1,1,0, 1,1,1}, {3, 4, 5}},
    {"no area: a segment in the plane, apart", 0,
     {0,0,0, 4,0,0, 0,4,0, 3,3,0, 4,4,0, 5,5,0}, {3, 4, 5}},
    {"no area: a point in the face", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,0, 1,1,0, 1,1,0}, {3, 4, 5}},
    {"no area: a point outside", 0,
     {0,0,0, 4,0,0, 0,4,0, 1,1,2, 1,1,2, 1,1,2}, {3, 4, 5}},
    {"no area, both: segments cross", 1,
     {0,0,0, 2,2,0, 4,4,0, 0,4,0, 3,1,0, 4,0,0}, {3, 4, 5}},
    {"no area, both: one above the other", 0,
     {0,0,0, 2,2,0, 4,4,0, 0,4,1, 3,1,1, 4,0,1}, {3, 4, 5}},
    {"no area, both: on one line, apart", 0,
     {0,0,0, 1,1,0, 2,2,0, 3,3,0, 4,4,0, 5,5,0}, {3, 4, 5}},
    {"no area, both: on one line, overlapping", 1,
     {0,0,0, 1,1,0, 3,3,0, 2,2,0, 4,4,0, 5,5,0}, {3, 4, 5}},
    {"no area, a common vertex: within the angle", 1,
     {0,0,0, 4,0,0, 0,4,0, 1,1,0, 2,2,0, 0,0,0}, {0, 3, 4}},
    {"no area, a common vertex: away", 0,
     {0,0,0, 4,0,0, 0,4,0, -1,-1,0, -2,-2,0, 0,0,0}, {0, 3, 4}},
    {"no area, both, a common vertex: one way", 1,
     {0,0,0, 1,1,1, 2,2,2, 3,3,3, 4,4,4, 0,0,0}, {0, 3, 4}},
    {"no area, both, a common vertex: opposite ways", 0,
     {0,0,0, 1,1,1, 2,2,2, -3,-3,-3, -4,-4,-4, 0,0,0}, {0, 3, 4}},
    {"no area: the third corner on the common edge", 0,
     {0,0,0, 4,0,0, 2,0,0, 0,-4,1, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"no area, both: beyond the common edge on one side", 1,
     {0,0,0, 4,0,0, 6,0,0, 5,0,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"no area, both: beyond the common edge on two sides", 0,
     {0,0,0, 4,0,0, 6,0,0, -1,0,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"no area, both: the common edge is a point, opposite ways", 0,
     {0,0,0, 0,0,0, 6,0,0, -1,0,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"no area, both: the common edge is a point, one way", 1,
     {0,0,0, 0,0,0, 6,0,0, 1,0,0, 0,0,0, 0,0,0}, {1, 0, 3}},
    {"a plane parts them but for rounding: a corner on an edge", 1,
     {0.2,0.2,0.6, 0,0,0.6, 0.2,0.5,0.7, 0.6,0.3,0.7, 0.1,0,0,
      0.049999999999999989,0.049999999999999989,0.6}, {3, 4, 5}}
};

/* Both answers for all 72 ways to name the corners and the faces; -1 when they differ. */
static int ask_all(const double *x, const int *f, const int *g, int exact_too) {
    static const int order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0},
                                    {1, 0, 2}};
    const int answer = clothi_faces_intersect(x, f, g);
    int       i, j, k, p[3], q[3];
    for (i = 0; i < 6; i++)
        for (j = 0; j < 6; j++) {
            for (k = 0; k < 3; k++) {
                p[k] = f[order[i][k]];
                q[k] = g[order[j][k]];
            }
            if (clothi_faces_intersect(x, p, q) != answer) return -1;
            if (clothi_faces_intersect(x, q, p) != answer) return -1;
            if (exact_too && exact_triangles(x, p, q) != answer) return -1;
            if (exact_too && exact_triangles(x, q, p) != answer) return -1;
        }
    return answer;
}

static void cases_drawn_by_hand(void) {
    const int f[3] = {0, 1, 2};
    int       i, k, turn;
    for (i = 0; i < (int)(sizeof drawings / sizeof *drawings); i++)
        for (turn = 0; turn < 3; turn++) {
            double x[18];
            for (k = 0; k < 18; k++) x[k / 3 * 3 + (k + turn) % 3] = drawings[i].x[k];
            for (exact_no_shortcuts = 0; exact_no_shortcuts < 2; exact_no_shortcuts++)
                if (!CHECK(ask_all(x, f, drawings[i].g, 1) == drawings[i].answer))
                    printf("  %s, x is axis %d\n", drawings[i].name, turn);
        }
    exact_no_shortcuts = 0;
}

/* --- random pairs --- */

static unsigned long long seed = 1;

static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) / 9007199254740992.0;
}

static int below(int n) { return (int)(uniform() * n); }

typedef enum kind { ROUGH, LATTICE, PLANE, LINE, SHAKEN, FAR_AWAY, MIXED_SIZES, KINDS } kind;

/* Six points: anywhere; on a lattice of few points, all over, in a slanted plane or on a line, so
 * that most pairs touch or have no area; the same off by units in the last place; far from the
 * origin; coordinates of sizes that differ by 1e12. */
static void make_points(kind how, double *x) {
    const int n = 2 + below(4);
    int       i, k;
    for (i = 0; i < 6; i++) {
        int u = below(n), v = below(n);
        for (k = 0; k < 3; k++) {
            double *a = x + 3 * i + k;
            switch (how) {
            case ROUGH: *a = uniform(); break;
            case PLANE: *a = k == 2 ? u + 2 * v : k ? v : u; break;
            case LINE: *a = (k + 1) * u; break;
            case SHAKEN: *a = 0.1 * (k == 2 ? 1 + u + 2 * v : 1 + (k ? v : u)); break;
            case FAR_AWAY: *a = 12345.6 + 1e-7 * below(n); break;
            case MIXED_SIZES: *a = below(2) ? below(n) : 1e-12 * below(n); break;
            default: *a = below(n); break;
            }
            if (how == SHAKEN)
                while (below(3) == 0) *a = nextafter(*a, below(2) ? 9.0 : -9.0);
        }
    }
}

static void random_pairs(void) {
    const int rounds = test_full() ? 400000 : test_quick() ? 4000 : 10000;
    int       how, i, k;
    for (how = 0; how < KINDS; how++) {
        int wrong = 0, hits = 0, lost = 0;
        for (i = 0; i < rounds; i++) {
            double x[18];
            int    f[3] = {0, 1, 2}, g[3] = {3, 4, 5}, answer;
            make_points((kind)how, x);
            for (k = 0; k < i % 3; k++) g[k] = f[k];    /* 0, 1, 2 shared vertices */
            answer = i % 16 == 0 ? ask_all(x, f, g, 0) : clothi_faces_intersect(x, f, g);
            exact_no_shortcuts = i % 2;
            wrong += answer != exact_triangles(x, f, g);
            hits += answer == 1;
            for (k = 0; k < 18; k++) x[k] = ldexp(x[k], -40);       /* exact: nothing changes */
            if (i % 4 == 0) lost += answer != clothi_faces_intersect(x, f, g);
        }
        exact_no_shortcuts = 0;
        printf("  kind %d: %d of %d intersect\n", how, hits, rounds);
        CHECK(wrong == 0);
        CHECK(lost == 0);
        CHECK(hits > 10 && hits < rounds);
    }
}

/* --- meshes --- */

typedef struct known {
    const char *name;
    int         pierce;                     /* published: pairs that name no common vertex, an edge
                                               of one through the inside of the other          */
    int         all;                        /* by the kit's definition                         */
} known;

static const known meshes[] = {
    {"body/body.obj", 28, 36},
    {"garments/tshirt_f.obj", 0, 0},
    {"garments/tshirt_f_clean.obj", 0, 2},  /* at a common vertex */
    {"garments/trousers_f_clean.obj", 0, 0},
    {"garments/skirt_f_clean.obj", 0, 0},
    {"garments/longskirt_f_clean.obj", 0, 0},
    {"patterns/shirt_mean_welded.obj", 47, 55},
    {"patterns/skirt_2_panels_welded.obj", 0, 0},
    {"patterns/skirt_8_panels_welded.obj", 0, 0},
    {"cloth/diffcloth_tshirt1900.obj", 0, 0},
    {"cloth/diffcloth_sock482.obj", 0, 0},
    {"cloth/codim_mat60x20.obj", 0, 0},     /* all in one plane */
    {"cloth/uipc_cloth80x80.obj", 0, 0},
    {"cloth/ipctk_thickcloth_t0.obj", 0, 0},
    {"cloth/ipctk_thickcloth_t1.obj", 38, 46},      /* 8 edges exactly through edges */
    {"shapes/spot.obj", 0, 0},
    {"shapes/fox.obj", 0, 0},
    {"nasty/soup.obj", 1248, 1248},
    {"nasty/moebius.obj", 0, 0},
    {"nasty/busted.obj", 0, 23893},         /* not welded: touches along every seam */
    {"nasty/skirt_f_unwelded.obj", 0, 4177},
    {"nasty/skirt_f_near_coincident.obj", 24, 73},
    {"nasty/skirt_f_duplicate_faces.obj", 0, 0},
    {"nasty/skirt_f_zero_area.obj", 0, 0},
    {"nasty/skirt_f_far_from_origin_1e5.obj", 0, 0},
    {"nasty/skirt_f_tiny_scale_1e-4.obj", 0, 0},
    {"nasty/skirt_f_shuffled_soup_holes.obj", 0, 0}
};

/* Kit and rational arithmetic, pair by pair. Returns how many intersect, *pierce of them widely. */
static int compare(int nv, const double *x, int nf, const int *faces, int *pierce) {
    const int n = exact_intersections(nv, x, nf, faces, NULL, 0);
    int      *ours = (int *)malloc(2 * ((size_t)n + 1u) * sizeof *ours), count = -1, i;
    int      *theirs = (int *)malloc(2 * ((size_t)n + 1u) * sizeof *theirs);
    if (!ours || !theirs) exit(1);
    exact_intersections(nv, x, nf, faces, theirs, n);
    CHECK(cloth_intersections(NULL, nv, x, nf, faces, n + 1, ours, &count) == CLOTH_OK);
    CHECK(count == n);
    if (count == n) CHECK(memcmp(ours, theirs, 2 * (size_t)n * sizeof *ours) == 0);
    for (*pierce = i = 0; i < n; i++)
        *pierce += exact_pierce(x, faces + 3 * theirs[2 * i], faces + 3 * theirs[2 * i + 1]);
    free(ours);
    free(theirs);
    return n;
}

static void shared_meshes(void) {
    int i, seen = 0;
    for (i = 0; i < (int)(sizeof meshes / sizeof *meshes); i++) {
        char        name[256];
        const char *path;
        cloth_mesh *m = NULL;
        int         n, pierce;
        snprintf(name, sizeof name, "data/%s", meshes[i].name);
        path = test_shared(name);
        if (!*path) continue;
        if (!CHECK(cloth_obj_load(NULL, path, NULL, &m) == CLOTH_OK)) continue;
        seen++;
        n = compare(m->nv, m->x, m->nf, m->faces, &pierce);
        if (n) printf("  %s: %d, of them %d pierce widely\n", meshes[i].name, n, pierce);
        CHECK(n == meshes[i].all);
        CHECK(pierce == meshes[i].pierce);
        cloth_mesh_destroy(NULL, m);
    }
    if (!seen) SKIP("no ../../shared/data");
}

/* --- the walking body, which cuts through itself at armpits and crotch --- */

/* Positions x [nv x 3] of a frame: the weighted sum of the joints' matrices times the rest. */
static int pose(const cloth_mesh *m, int frame, double *x) {
    FILE    *f = fopen(test_shared("data/motion/walk_02_01.skin"), "rb");
    unsigned head[6];                       /* magic 8 bytes, frames, joints, fps, lead-in */
    float   *joint = NULL;
    char     line[256];
    int      v, j, k, good = f && fread(head, 4, 6, f) == 6 && head[3] < 1000;
    if (good) joint = (float *)malloc(48u * (size_t)head[3]);
    good = joint && fseek(f, 24 + 48L * frame * (long)head[3], SEEK_SET) == 0 &&
           fread(joint, 48, head[3], f) == head[3];
    if (f) fclose(f);
    f = good ? fopen(test_shared("data/body/weights_cmu.txt"), "r") : NULL;
    good = f != NULL;
    memset(x, 0, 3 * (size_t)m->nv * sizeof *x);
    while (good && fgets(line, sizeof line, f)) {
        double w;
        if (sscanf(line, "%d %d %lf", &v, &j, &w) != 3) continue;
        for (k = 0; k < 3; k++) {
            const float  *A = joint + 12 * j + 4 * k;
            const double *r = m->x + 3 * v;
            x[3 * v + k] += w * ((double)A[0] * r[0] + (double)A[1] * r[1] + (double)A[2] * r[2] +
                                 (double)A[3]);
        }
    }
    if (f) fclose(f);
    free(joint);
    return good;
}

static void walking_body(void) {
    static const int frames[5] = {0, 60, 174, 288, 402}, published[5] = {28, 192, 257, 660, 291};
    cloth_mesh *m = NULL;
    const char *path = test_shared("data/body/body.obj");
    double     *x;
    int         i, pierce;
    if (!*path || cloth_obj_load(NULL, path, NULL, &m) != CLOTH_OK) SKIP("no ../../shared/data");
    x = (double *)malloc(3 * (size_t)m->nv * sizeof *x);
    if (!x) exit(1);
    for (i = 0; i < (test_full() ? 5 : 2) && CHECK(pose(m, frames[i], x)); i++) {
        const int n = compare(m->nv, x, m->nf, m->faces, &pierce);
        printf("  frame %d: %d, of them %d pierce widely\n", frames[i], n, pierce);
        CHECK(pierce == published[i]);
    }
    free(x);
    cloth_mesh_destroy(NULL, m);
}

/* A sheet crumpled at random: many intersections of every sort, also between neighbours. */
static void crumpled_sheets(void) {
    int round, total = 0, wide = 0;
    for (round = 0; round < 6; round++) {
        cloth_mesh *m = NULL;
        int         i, pierce;
        if (!CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 16, 16, 1, 1, &m) == CLOTH_OK))
            return;
        for (i = 0; i < 3 * m->nv; i++) {
            m->x[i] += 0.04 * (round + 1) * (uniform() - 0.5);
            if (round > 2) m->x[i] = floor(40 * m->x[i]) / 40;      /* much touches exactly */
        }
        total += compare(m->nv, m->x, m->nf, m->faces, &pierce);
        wide += pierce;
        cloth_mesh_destroy(NULL, m);
    }
    printf("  %d pairs, of them %d pierce widely\n", total, wide);
    CHECK(wide > 100 && total > wide + 100);
}

/* --- workers, memory, refusals --- */

static void play(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    const int reversed = *(int *)user, n = (count + grain - 1) / grain;
    int       i;
    for (i = 0; i < n; i++) {
        const int at = reversed ? n - 1 - i : i;
        fn(at * grain, (at + 1) * grain < count ? (at + 1) * grain : count, i % 16, ctx);
    }
}

static cloth_mesh *crumpled(void) {
    cloth_mesh *m = NULL;
    int         i;
    seed = 77;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 24, 24, 1, 1, &m) != CLOTH_OK) exit(1);
    for (i = 0; i < 3 * m->nv; i++) m->x[i] += 0.1 * (uniform() - 0.5);
    return m;
}

static void workers_do_not_matter(void) {
    cloth_mesh *m = crumpled();
    cloth_hooks hooks;
    static int  serial[20000], other[20000];
    int         reversed, n = 0, k = 0;
    memset(&hooks, 0, sizeof hooks);
    hooks.parallel.run = play;
    hooks.parallel.user = &reversed;
    hooks.parallel.max_workers = 16;
    CHECK(cloth_intersections(NULL, m->nv, m->x, m->nf, m->faces, 10000, serial, &n) == CLOTH_OK);
    CHECK(n > 100 && n < 10000);
    for (reversed = 0; reversed < 2; reversed++) {
        other[2 * n] = -3;
        CHECK(cloth_intersections(&hooks, m->nv, m->x, m->nf, m->faces, 10000, other, &k) ==
              CLOTH_OK);
        CHECK(k == n && memcmp(serial, other, 2 * (size_t)n * sizeof *serial) == 0);
        CHECK(other[2 * n] == -3);          /* room that is not needed is left alone */
    }
    CHECK(cloth_intersections(NULL, m->nv, m->x, m->nf, m->faces, 0, NULL, &k) == CLOTH_OK);
    CHECK(k == n);
    other[14] = -5;
    CHECK(cloth_intersections(NULL, m->nv, m->x, m->nf, m->faces, 7, other, NULL) == CLOTH_OK);
    CHECK(memcmp(serial, other, 14 * sizeof *serial) == 0 && other[14] == -5);
    cloth_mesh_destroy(NULL, m);
}

static void allocator_fails(void) {
    cloth_mesh *m = crumpled();
    int         fail, done = 0, n = 0;
    for (fail = 1; fail < 40 && !done; fail++) {
        host         h;
        cloth_hooks  hooks = host_hooks(&h);
        cloth_status status;
        int          pairs[2] = {-1, -1};
        h.fail_at = fail;
        n = 99;
        status = cloth_intersections(&hooks, m->nv, m->x, m->nf, m->faces, 1, pairs, &n);
        done = status == CLOTH_OK;
        CHECK(h.live == 0);
        CHECK(done || (status == CLOTH_ERR_MEMORY && h.errors == 1 && n == 0 && pairs[0] == -1));
    }
    CHECK(done && fail > 7 && n > 100);
    cloth_mesh_destroy(NULL, m);
}

static void refusals(void) {
    const int bad[3] = {0, 1, 3}, twice[3] = {0, 1, 1}, good[3] = {0, 1, 2};
    double    x[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    int       n = 5, pairs[2];
    host        h;
    cloth_hooks hooks = host_hooks(&h);
    CHECK(cloth_intersections(&hooks, 3, x, 1, bad, 1, pairs, &n) == CLOTH_ERR_MESH && n == 0);
    CHECK(cloth_intersections(&hooks, 3, x, 1, twice, 1, pairs, &n) == CLOTH_ERR_MESH);
    CHECK(cloth_intersections(&hooks, 3, NULL, 1, good, 1, pairs, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_intersections(&hooks, 3, x, 1, NULL, 1, pairs, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_intersections(&hooks, 3, x, 1, good, 1, NULL, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_intersections(&hooks, 3, x, 1, good, -1, pairs, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_intersections(&hooks, -3, x, 1, good, 1, pairs, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(h.lines == 7);
    CHECK(cloth_intersections(&hooks, 3, x, -1, good, 1, pairs, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_intersections(&hooks, 0, x, 1, good, 1, pairs, &n) != CLOTH_OK);
    CHECK(cloth_intersections(&hooks, 3, x, 0x7fffffff, good, 1, pairs, &n) != CLOTH_OK);
    CHECK(h.lines == 10 && h.live == 0);
    x[4] = NAN;
    CHECK(cloth_intersections(&hooks, 3, x, 1, good, 1, pairs, &n) == CLOTH_ERR_NONFINITE);
    CHECK(strstr(h.text, "x[4] = NaN") != NULL);
    CHECK(cloth_intersections(NULL, 0, NULL, 0, NULL, 0, NULL, &n) == CLOTH_OK && n == 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(cases_drawn_by_hand);
    RUN(random_pairs);
    RUN(crumpled_sheets);
    RUN(shared_meshes);
    RUN(walking_body);
    RUN(workers_do_not_matter);
    RUN(allocator_fails);
    RUN(refusals);
    return TEST_END();
}
