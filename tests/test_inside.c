/* test_inside.c - faces of an obstacle that lie inside of it: closed forms, brute-force winding
 * numbers and cuts in long double, the scanned walk, steps, workers, failures.   tier: default
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_inside.c -o test_inside -lm && ./test_inside */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "test.h"
#include "host.h"
#include "body.h"
#include "shapes.h"

static double seconds(void) { return (double)clock() / CLOCKS_PER_SEC; }

/* --- references --- */

static long double volume(const double *a, const double *b, const double *c, const double *d) {
    long double u[3], v[3], w[3];
    int         i;
    for (i = 0; i < 3; i++) {
        u[i] = (long double)b[i] - (long double)a[i];
        v[i] = (long double)c[i] - (long double)a[i];
        w[i] = (long double)d[i] - (long double)a[i];
    }
    return w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2])
           + w[2] * (u[0] * v[1] - u[1] * v[0]);
}

static int pierces(const double *p, const double *q, const double *const *t) {
    const long double s = volume(t[0], t[1], t[2], p), e = volume(t[0], t[1], t[2], q);
    const long double a = volume(p, q, t[0], t[1]), b = volume(p, q, t[1], t[2]);
    const long double c = volume(p, q, t[2], t[0]);
    if ((s > 0) == (e > 0)) return 0;
    return (a > 0 && b > 0 && c > 0) || (a < 0 && b < 0 && c < 0);
}

/* In general position: the faces cut each other away from the vertices that they share. */
static int cuts(const double *x, const int *f, const int *g) {
    const double *a[3], *b[3];
    int           i, j, shared[2][3] = {{0, 0, 0}, {0, 0, 0}}, n = 0;
    for (i = 0; i < 3; i++) {
        a[i] = x + 3 * f[i];
        b[i] = x + 3 * g[i];
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            if (f[i] == g[j]) n += shared[0][i] = shared[1][j] = 1;
    if (n > 1) return 0;
    for (i = 0; i < 3; i++) {
        j = (i + 1) % 3;
        if (!shared[0][i] && !shared[0][j] && pierces(a[i], a[j], b)) return 1;
        if (!shared[1][i] && !shared[1][j] && pierces(b[i], b[j], a)) return 1;
    }
    return 0;
}

static int boxes_apart(const double *x, const int *f, const int *g) {
    int a, i;
    for (a = 0; a < 3; a++) {
        double lo[2] = {1e300, 1e300}, hi[2] = {-1e300, -1e300};
        for (i = 0; i < 3; i++) {
            lo[0] = fmin(lo[0], x[3 * f[i] + a]);
            hi[0] = fmax(hi[0], x[3 * f[i] + a]);
            lo[1] = fmin(lo[1], x[3 * g[i] + a]);
            hi[1] = fmax(hi[1], x[3 * g[i] + a]);
        }
        if (lo[0] > hi[1] || lo[1] > hi[0]) return 1;
    }
    return 0;
}

/* The winding number outside of face f: solid angles of the others at its centroid, whose own half
 * (principal value 0) is to be taken off. */
static long double outside(const double *x, int nf, const int *faces, int f) {
    double p[3];
    int    a, i;
    for (a = 0; a < 3; a++)
        for (p[a] = 0, i = 0; i < 3; i++) p[a] += x[3 * faces[3 * f + i] + a] / 3;
    return shape_winding(x, nf, faces, p, f) - 0.5L;
}

/* --- a mesh and its answer --- */

typedef struct answer {
    unsigned char *exempt;
    int            count;
    clothi_inside *work;
} answer;

static answer ask(const shape *s) {
    answer a;
    memset(&a, 0, sizeof a);
    a.exempt = (unsigned char *)calloc((size_t)s->nf + 1, 1);
    if (!a.exempt) exit(2);
    CHECK(clothi_inside_create(NULL, s->nv, s->nf, s->faces, &a.work) == CLOTH_OK);
    if (a.work) CHECK(clothi_inside_find(a.work, s->x, a.exempt, &a.count) == CLOTH_OK);
    return a;
}

static void drop(answer *a) {
    clothi_inside_free(a->work);
    free(a->exempt);
    memset(a, 0, sizeof *a);
}

/* Every pair and every face against the references. */
static void check_all(const shape *s, const answer *a) {
    int f, g, wrong_cut = 0, wrong = 0;
    for (f = 0; f < s->nf; f++) {
        int cut = 0;
        for (g = 0; g < s->nf && !cut; g++)
            cut = f != g && !boxes_apart(s->x, s->faces + 3 * f, s->faces + 3 * g)
                  && cuts(s->x, s->faces + 3 * f, s->faces + 3 * g);
        wrong_cut += cut != (a->work->flags[f] == CLOTHI_INSIDE_CUT);
        if (!cut) wrong += (outside(s->x, s->nf, s->faces, f) > 0.5L) != (a->exempt[f] != 0);
    }
    CHECK(wrong_cut == 0);
    CHECK(wrong == 0);
}

static void two_spheres(void) {
    const double at[2][3] = {{-0.6, 0, 0}, {0.6, 0.1, 0.05}};
    const int    n = 16;
    shape        s = {0, 0, NULL, NULL};
    answer       a;
    int          f, i, k, cut = 0, covered = 0, bad = 0, half;
    shape_sphere(&s, at[0], 1, n);
    half = s.nf;
    shape_sphere(&s, at[1], 1, n);
    shape_turn(&s, 0);
    a = ask(&s);
    for (f = 0; f < s.nf; f++) {
        double c[3] = {0, 0, 0}, p[3], d = 0;
        shape  o = {0, 0, NULL, NULL};
        memcpy(p, at[f < half], sizeof p);      /* the other's centre, turned likewise */
        o.nv = 1;
        o.x = p;
        shape_turn(&o, 0);
        for (i = 0; i < 9; i++) c[i % 3] += s.x[3 * s.faces[3 * f + i / 3] + i % 3] / 3;
        for (k = 0; k < 3; k++) d += (c[k] - p[k]) * (c[k] - p[k]);
        d = sqrt(d);
        cut += a.work->flags[f] == CLOTHI_INSIDE_CUT;
        covered += a.work->flags[f] == CLOTHI_INSIDE_COVERED;
        /* the polyhedron lies between the radii 1 and 0.98 */
        if (d < 0.98) bad += !a.exempt[f];
        if (d > 1) bad += a.work->flags[f] == CLOTHI_INSIDE_COVERED;
        if (d > 1.2) bad += a.exempt[f];
    }
    printf("    two spheres of %d faces: %d cut, %d covered\n", half, cut, covered);
    CHECK(bad == 0);
    CHECK(cut > 50 && covered > 200 && a.count == cut + covered);
    check_all(&s, &a);
    drop(&a);
    shape_free(&s);
}

static void nested_and_apart(void) {
    const double o[3] = {0, 0, 0}, far[3] = {5, 0, 0};
    shape        s = {0, 0, NULL, NULL};
    answer       a;
    int          f, k, inner, wrong = 0;
    shape_sphere(&s, o, 1, 6);
    inner = s.nf;
    shape_sphere(&s, o, 0.5, 6);
    shape_sphere(&s, far, 1, 6);
    a = ask(&s);
    for (f = 0; f < s.nf; f++) wrong += a.exempt[f] != (f >= inner && f < 2 * inner);
    CHECK(wrong == 0 && a.count == inner);
    drop(&a);
    for (f = inner; f < 2 * inner; f++) {       /* turned inside out: a hollow, no overlap */
        k = s.faces[3 * f];
        s.faces[3 * f] = s.faces[3 * f + 1];
        s.faces[3 * f + 1] = k;
    }
    a = ask(&s);
    CHECK(a.count == 0);
    drop(&a);
    shape_free(&s);
}

/* A sphere and its mirror image, edges on edges all along the cut. Closed form: the faces beyond
 * the mirror are covered or cut. */
static void mirrored_spheres(void) {
    const double at[2][3] = {{-0.6, 0, 0}, {0.6, 0, 0}};
    shape        s = {0, 0, NULL, NULL};
    answer       a;
    int          f, i, wrong = 0;
    shape_sphere(&s, at[0], 1, 48);
    shape_sphere(&s, at[1], 1, 48);
    a = ask(&s);
    for (f = 0; f < s.nf; f++) {
        const double sign = f < s.nf / 2 ? 1 : -1;
        double       lo = 1, hi = -1;
        for (i = 0; i < 3; i++) {
            lo = fmin(lo, sign * s.x[3 * s.faces[3 * f + i]]);
            hi = fmax(hi, sign * s.x[3 * s.faces[3 * f + i]]);
        }
        if (lo > 0.01) wrong += a.work->flags[f] != CLOTHI_INSIDE_COVERED;
        else if (hi < -0.01) wrong += a.exempt[f];
    }
    CHECK(wrong == 0 && a.count > 2500);
    drop(&a);
    shape_free(&s);
}

/* More boxes on a ray than fit its list: 300 shells; all but the outermost are inside. */
static void many_shells(void) {
    shape  s = {0, 0, NULL, NULL};
    answer a;
    int    i, f, wrong = 0;
    for (i = 0; i < 300; i++) {
        const double r = 1 + 0.01 * i, lo[3] = {-r, -r, -r}, hi[3] = {r, r, r};
        shape_box(&s, lo, hi);
    }
    shape_turn(&s, 0);
    a = ask(&s);
    for (f = 0; f < s.nf; f++) wrong += a.exempt[f] != (f < s.nf - 12);
    CHECK(wrong == 0);
    drop(&a);
    shape_free(&s);
}

/* Boxes with sides in common planes: nothing is in general position, nothing is cut through, and
 * the rays of a box disagree. Only the two ends lie inside. */
static void flat_on_flat(void) {
    /* thirds of these coordinates are rounded: a centroid is off its plane by an ulp or two */
    const double lo[2][3] = {{0, 0.1, 0.3}, {1, 0.1, 0.3}};
    const double hi[2][3] = {{2, 0.7, 1.7}, {3, 0.7, 1.7}};
    shape        s = {0, 0, NULL, NULL};
    answer       a;
    int          f, i, wrong = 0;
    shape_box(&s, lo[0], hi[0]);
    shape_box(&s, lo[1], hi[1]);
    a = ask(&s);
    for (f = 0; f < s.nf; f++) {
        int end = 1;
        for (i = 0; i < 3; i++) end &= fabs(s.x[3 * s.faces[3 * f + i]] - 1.5) < 0.6;
        wrong += a.exempt[f] != end;
    }
    CHECK(wrong == 0 && a.count == 4 && a.work->rays >= s.nf);
    drop(&a);
    shape_free(&s);
}

/* An open bowl has no inside; in a closed sphere it is covered. */
static void open_parts(void) {
    const double o[3] = {0, 0, 0};
    shape        s = {0, 0, NULL, NULL};
    answer       a;
    int          f, n, wrong = 0;
    shape_sphere(&s, o, 1, 8);
    n = s.nf - 40;                              /* holes at the end of the list: the poles */
    s.nf = n;
    shape_sphere(&s, o, 0.5, 6);
    a = ask(&s);
    CHECK(a.count == 0);
    drop(&a);
    shape_sphere(&s, o, 2, 8);
    a = ask(&s);
    for (f = 0; f < s.nf; f++) wrong += a.exempt[f] != (f < n + 4 * 6 * 5);
    CHECK(wrong == 0);
    drop(&a);
    shape_free(&s);
}

/* --- the walk --- */

static void walk(void) {
    /* counted by others in these frames: pairs of faces that cut and share no vertex */
    static const struct { int frame, pairs; } known[] = {{60, 192}, {174, 257}, {288, 660},
                                                         {402, 291}, {110, -1}, {160, -1}};
    const int      frames = test_quick() ? 2 : 6;
    body           b;
    clothi_inside *k;
    unsigned char *exempt;
    double        *x;
    int            i, f, p, wrong = 0, asked, wrong_ray = 0;
    if (!body_load(&b)) SKIP("no body beside the checkout");
    x = (double *)malloc(3 * (size_t)b.mesh->nv * sizeof *x);
    exempt = (unsigned char *)malloc((size_t)b.mesh->nf);
    CHECK(clothi_inside_create(NULL, b.mesh->nv, b.mesh->nf, b.mesh->faces, &k) == CLOTH_OK);
    if (!x || !exempt || !k) exit(2);
    printf("    frame  exempt     cut covered   pairs  sharing regions    ms  asked\n");
    for (i = 0; i < frames; i++) {
        int    count = 0, cut = 0, pairs = 0, sharing = 0, rays, near_by = 0, warm;
        double ms;
        for (warm = known[i].frame - 1; warm <= known[i].frame; warm++) {
            body_pose(&b, warm, x);
            ms = seconds();
            CHECK(clothi_inside_find(k, x, exempt, &count) == CLOTH_OK);
            ms = 1e3 * (seconds() - ms);
        }
        for (p = 0; p < k->pairs.count; p++) {
            const int *u = k->faces + 3 * k->pairs.pair[2 * p];
            const int *v = k->faces + 3 * k->pairs.pair[2 * p + 1];
            int        j, n = 0;
            for (j = 0; j < 9; j++) n += u[j / 3] == v[j % 3];
            if (k->hit[p] != CLOTHI_INSIDE_CUT) continue;
            pairs += n == 0;
            sharing += n > 0;
        }
        if (known[i].pairs >= 0) CHECK(pairs == known[i].pairs);
        rays = k->rays;
        for (f = 0, asked = 0; f < k->nf; f++) {
            int near_face = k->flags[f] == CLOTHI_INSIDE_COVERED;
            cut += k->flags[f] == CLOTHI_INSIDE_CUT;
            near_by += near_face;
            if (k->flags[f] == CLOTHI_INSIDE_CUT) continue;
            wrong_ray += (clothi_inside_outer(k, f) >= 1) != near_face;
            if (near_face ? near_by % 12 : f % 271) continue;
            asked++;
            wrong += (outside(x, k->nf, k->faces, f) > 0.5L) != near_face;
        }
        printf("    %5d %7d %7d %7d %7d %8d %7d %5.1f %6d\n", known[i].frame, count, cut, near_by,
               pairs, sharing, k->regions, ms, asked);
        CHECK(count == cut + near_by && rays < 1000);
    }
    CHECK(wrong == 0);
    CHECK(wrong_ray == 0);
    clothi_inside_free(k);
    free(x);
    free(exempt);
    body_free(&b);
}

/* --- a step, features --- */

static void step(void) {
    const double   o[3] = {0, 0, 0}, b[3] = {1.5, 0.1, 0.2};
    shape          s = {0, 0, NULL, NULL};
    answer         a, c;
    clothi_inside *k;
    unsigned char *swept;
    double        *xb;
    int            f, i, n, both = 0, wrong = 0;
    shape_sphere(&s, o, 1, 8);
    n = s.nv;
    shape_sphere(&s, b, 1, 8);
    shape_turn(&s, 0);
    swept = (unsigned char *)calloc((size_t)s.nf, 1);
    xb = (double *)malloc(3 * (size_t)s.nv * sizeof *xb);
    if (!swept || !xb) exit(2);
    memcpy(xb, s.x, 3 * (size_t)s.nv * sizeof *xb);
    for (i = 3 * n; i < 3 * s.nv; i += 3) xb[i] += 0.6;
    a = ask(&s);
    CHECK(clothi_inside_create(NULL, s.nv, s.nf, s.faces, &k) == CLOTH_OK);
    CHECK(clothi_inside_sweep(k, s.x, xb, swept, &i) == CLOTH_OK);
    n = i;
    free(s.x);
    s.x = xb;
    c = ask(&s);
    for (f = 0; f < s.nf; f++) {
        both += a.exempt[f] != c.exempt[f];
        wrong += swept[f] != (a.exempt[f] || c.exempt[f]);
        n -= swept[f];
    }
    CHECK(wrong == 0 && both > 10 && n == 0);
    CHECK(k->known && memcmp(k->flags, c.work->flags, (size_t)s.nf) == 0);
    i = k->rays;
    k->rays = 0;                                /* the next step starts where this one ended */
    CHECK(clothi_inside_sweep(k, s.x, s.x, swept, NULL) == CLOTH_OK);
    CHECK(k->rays == 0 && memcmp(swept, c.exempt, (size_t)s.nf) == 0);
    clothi_inside_free(k);
    drop(&a);
    drop(&c);
    free(swept);
    shape_free(&s);
}

static void spread(void) {
    const int            faces[] = {0, 1, 2, 2, 1, 3, 3, 1, 4};
    const int            edges[] = {0, 1, 2, 1, 3, 4, 3, 5, 6};
    const unsigned char  exempt[] = {1, 1, 0};
    const unsigned char  vertex[] = {1, 0, 1, 0, 0, 0}, edge[] = {1, 1, 1, 0, 1, 0, 0};
    unsigned char        out[8];
    clothi_inside_spread(3, faces, exempt, 6, out);
    CHECK(memcmp(out, vertex, 6) == 0);
    clothi_inside_spread(3, edges, exempt, 7, out);
    CHECK(memcmp(out, edge, 7) == 0);
}

/* --- workers and failures --- */

static void run_backwards(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    const int piece = *(const int *)user;
    int       end = count;
    (void)grain;
    while (end > 0) {
        const int begin = end > piece ? end - piece : 0;
        fn(begin, end, 0, ctx);
        end = begin;
    }
}

static shape chain(void) {
    shape s = {0, 0, NULL, NULL};
    int   i;
    for (i = 0; i < 5; i++) {
        const double at[3] = {1.3 * i, 0.2 * i, 0.1};
        shape_sphere(&s, at, 1, 20);
    }
    shape_turn(&s, 0);
    return s;
}

static void workers(void) {
    int            piece[] = {1, 7, 500}, i;
    shape          s = chain();
    answer         a = ask(&s);
    unsigned char *e = (unsigned char *)calloc((size_t)s.nf, 1);
    for (i = 0; i < 3; i++) {
        cloth_hooks    hooks;
        clothi_inside *k;
        memset(&hooks, 0, sizeof hooks);
        hooks.parallel.run = run_backwards;
        hooks.parallel.user = &piece[i];
        hooks.parallel.max_workers = 1;
        CHECK(clothi_inside_create(&hooks, s.nv, s.nf, s.faces, &k) == CLOTH_OK);
        CHECK(clothi_inside_find(k, s.x, e, NULL) == CLOTH_OK);
        CHECK(memcmp(e, a.exempt, (size_t)s.nf) == 0);
        CHECK(memcmp(k->flags, a.work->flags, (size_t)s.nf) == 0);
        clothi_inside_free(k);
    }
    CHECK(a.count > 500);
    free(e);
    drop(&a);
    shape_free(&s);
}

/* A box that wanders along a chain of balls and back, as cloth would: of the faces that meet it the
 * answer is the one of all faces, and no face is exempt that is not among those. */
static void near_cloth(void) {
    shape          s = chain();
    answer         all = ask(&s);
    clothi_inside *k;
    unsigned char *got = (unsigned char *)calloc((size_t)s.nf, 1);
    unsigned char *room = (unsigned char *)calloc((size_t)s.nv, 1);
    int            i, f, a, j, missed = 0, wrong = 0, exempt = 0, fewer = 0, fresh = 0;
    if (!got || !room) exit(2);
    CHECK(clothi_inside_create(NULL, s.nv, s.nf, s.faces, &k) == CLOTH_OK);
    for (i = 0; i < 24; i++) {
        const double t = (i < 16 ? i : 31 - i) / 15.0;          /* there and half back */
        double       box[6];
        for (a = 0; a < 3; a++) {
            const double middle = (1 - t) * s.x[a] + t * s.x[3 * (s.nv - 1) + a];
            box[a] = middle - 0.6;
            box[3 + a] = middle + 0.6;
        }
        clothi_inside_near(k, s.x, s.x, box, 0.5, room);
        fresh += !k->known;
        CHECK(clothi_inside_find(k, s.x, got, NULL) == CLOTH_OK);
        for (f = 0; f < s.nf; f++) {
            int meets = 1;
            for (a = 0; a < 3; a++) {
                double lo = HUGE_VAL, hi = -HUGE_VAL;
                for (j = 0; j < 3; j++) {
                    lo = fmin(lo, s.x[3 * s.faces[3 * f + j] + a]);
                    hi = fmax(hi, s.x[3 * s.faces[3 * f + j] + a]);
                }
                meets &= lo <= box[3 + a] && hi >= box[a];
            }
            missed += meets && got[f] != all.exempt[f];
            wrong += got[f] && !all.exempt[f];
            exempt += got[f];
            fewer += all.exempt[f] && !got[f];
        }
    }
    CHECK(missed == 0);
    CHECK(wrong == 0);
    CHECK(exempt > 1000 && fewer > 1000);
    CHECK(fresh > 4 && fresh < 24);             /* the list is kept, and renewed */
    clothi_inside_free(k);
    free(got);
    free(room);
    drop(&all);
    shape_free(&s);
}

static void failures(void) {
    static host    h;
    cloth_hooks    hooks = host_hooks(&h);
    shape          s = chain();
    unsigned char *e = (unsigned char *)malloc((size_t)s.nf);
    int            at, done = 0, count, calls;
    double         keep;
    if (!e) exit(2);
    for (at = 1; !done && at < 100; at++) {
        clothi_inside *k = NULL;
        cloth_status   status;
        h.calls = h.errors = 0;
        h.fail_at = at;
        memset(e, 7, (size_t)s.nf);
        status = clothi_inside_create(&hooks, s.nv, s.nf, s.faces, &k);
        CHECK((status == CLOTH_OK) == (k != NULL));
        if (k) status = clothi_inside_find(k, s.x, e, &count);
        done = status == CLOTH_OK;
        CHECK(done || (status == CLOTH_ERR_MEMORY && h.errors >= 1 && e[0] == 7));
        h.fail_at = 0;
        if (k && !done) {                       /* and then it works */
            CHECK(clothi_inside_find(k, s.x, e, &count) == CLOTH_OK && count > 500);
        }
        clothi_inside_free(k);
        CHECK(h.live == 0);
    }
    CHECK(done && at > 10);
    {
        clothi_inside *k = NULL;
        CHECK(clothi_inside_create(&hooks, s.nv, s.nf, s.faces, &k) == CLOTH_OK);
        CHECK(clothi_inside_find(k, s.x, e, &count) == CLOTH_OK);
        calls = h.calls;
        keep = s.x[5];
        s.x[5] += 1e-3;                         /* another pose: nothing is asked for */
        CHECK(clothi_inside_find(k, s.x, e, &count) == CLOTH_OK && h.calls == calls);
        s.x[5] = NAN;
        memset(e, 7, (size_t)s.nf);
        h.errors = 0;
        CHECK(clothi_inside_find(k, s.x, e, &count) == CLOTH_ERR_NONFINITE);
        CHECK(h.errors == 1 && strstr(h.text, "x[5]") != NULL && e[0] == 7 && e[s.nf - 1] == 7);
        s.x[5] = keep;
        CHECK(clothi_inside_find(k, s.x, e, &count) == CLOTH_OK && e[0] != 7);
        clothi_inside_free(k);
    }
    CHECK(h.live == 0);
    free(e);
    shape_free(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(two_spheres);
    RUN(nested_and_apart);
    RUN(mirrored_spheres);
    RUN(many_shells);
    RUN(flat_on_flat);
    RUN(open_parts);
    RUN(walk);
    RUN(step);
    RUN(spread);
    RUN(workers);
    RUN(near_cloth);
    RUN(failures);
    return TEST_END();
}
