/* test_kdsm.c - the space round a body (examples/kdsm/kdsm.h): its mesh against what hangs together
 * and what is covered, point location against brute force, derivatives against differences, the
 * ways from cloth to displacement and back, a predictor and its file, refusals, a failing
 * allocator.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. test_kdsm.c \
 *      -o test_kdsm -lm && ./test_kdsm */
#define KDSM_IMPLEMENTATION
#include "../examples/kdsm/learn.h"
#include "test.h"
#include "host.h"
#include "shapes.h"

static host        told;
static figure      body;
static double      T[12 * SHAPES_BONES];
static kdsm_space *space;                   /* of the body by formula, made once               */
static kdsm_desc   basic;

static unsigned long long seed = 1;

static double uniform(double a, double b) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return a + (b - a) * (double)(seed >> 11) / 9007199254740992.0;
}

static kdsm_desc desc_of(const figure *f) {
    kdsm_desc d = kdsm_desc_default();
    figure_body(f, &d);
    d.hooks = host_hooks(&told);
    return d;
}

static kdsm_space *make(const kdsm_desc *d) {
    kdsm_space        *s = NULL;
    const cloth_status status = kdsm_create(d, &s);
    if (status) printf("%s\n%s", cloth_status_text(status), told.text);
    CHECK(status == CLOTH_OK && s);
    if (!s) exit(2);
    return s;
}

static cloth_grid *grid_of(const kdsm_desc *d) {
    cloth_grid_desc g = cloth_grid_desc_default();
    cloth_grid     *grid = NULL;
    g.nv = d->nv, g.x = d->x, g.nf = d->nf, g.faces = d->faces;
    g.cell = d->cell > 0 ? d->cell : 0.5 * d->coarse / (1 << d->levels);
    g.band = d->thickness + 2 * g.cell;
    CHECK(cloth_grid_create(&g, &grid) == CLOTH_OK);
    if (!grid) exit(2);
    return grid;
}

static double phi_at(const cloth_grid *grid, const double *x) {
    double phi = 0;
    CHECK(cloth_grid_sample(grid, x, &phi, NULL) == CLOTH_OK);
    return phi;
}

/* Both arms turned into the trunk by an angle, elbows bent: space over space. */
static void arms_in(double angle, double *to) {
    const double shift[3] = {0, 0, 0};
    double       turn[SHAPES_BONES][3];
    memset(turn, 0, sizeof turn);
    turn[3][2] = -angle, turn[4][2] = angle;
    turn[5][0] = turn[6][0] = -1;
    shapes_bones((const double (*)[3])turn, shift, to);
}

/* --- the mesh --- */

typedef struct side {                       /* a face of a tetrahedron, corners rising         */
    int v[3], sign, tet;
} side;

static int by_corners(const void *a, const void *b) {
    const side *p = (const side *)a, *q = (const side *)b;
    int         k;
    for (k = 0; k < 3; k++)
        if (p->v[k] != q->v[k]) return p->v[k] < q->v[k] ? -1 : 1;
    return p->tet < q->tet ? -1 : p->tet > q->tet;
}

static int by_place(const void *a, const void *b) {
    const double *p = (const double *)a, *q = (const double *)b;
    int           k;
    for (k = 0; k < 3; k++)
        if (p[k] < q[k] || p[k] > q[k]) return p[k] < q[k] ? -1 : 1;
    return 0;
}

/* All faces of the mesh, sorted, outward orientation as the sign of the permutation. */
static side *sides_of(const kdsm_space *s) {
    static const int out[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    side            *list = (side *)calloc(4 * (size_t)s->nt, sizeof *list);
    int              t, k, i, j;
    if (!list) exit(2);
    for (t = 0; t < s->nt; t++)
        for (k = 0; k < 4; k++) {
            side *f = list + 4 * t + k;
            f->tet = t, f->sign = 1;
            for (i = 0; i < 3; i++) f->v[i] = s->tet[4 * t + out[k][i]];
            for (i = 0; i < 2; i++)
                for (j = 0; j < 2 - i; j++)
                    if (f->v[j] > f->v[j + 1]) {
                        const int swap = f->v[j];
                        f->v[j] = f->v[j + 1], f->v[j + 1] = swap, f->sign = -f->sign;
                    }
        }
    qsort(list, 4 * (size_t)s->nt, sizeof *list, by_corners);
    return list;
}

/* A crack is a face with one tetrahedron inside of the thickened body. */
static void hangs_together(const kdsm_space *s, const kdsm_desc *d) {
    cloth_grid        *grid = grid_of(d);
    const kdsm_quality q = kdsm_measure(s, NULL);
    side              *list = sides_of(s);
    double             volume = 0, least = HUGE_VAL, *x;
    int                i, j, k, outer = 0, bad = 0, same = 0, halved = 0;
    for (i = 0; i < 4 * s->nt; i = j) {
        int sum = 0;
        for (j = i; j < 4 * s->nt && memcmp(list[i].v, list[j].v, sizeof list[i].v) == 0; j++)
            sum += list[j].sign;
        bad += j - i > 2 || (j - i == 2 && sum != 0);
        if (j - i == 1) {                   /* divergence theorem: x . n / 3 */
            const double *a = s->v + 3 * list[i].v[0], *b = s->v + 3 * list[i].v[1];
            const double *c = s->v + 3 * list[i].v[2];
            double        n[3], m[3];
            kdsmi_cross(b, c, n);
            volume += sum * kdsmi_dot(a, n) / 6;
            for (k = 0; k < 3; k++) m[k] = (a[k] + b[k] + c[k]) / 3;
            least = fmin(least, fmin(phi_at(grid, m), fmin(phi_at(grid, a), phi_at(grid, b))));
            outer++;
        }
    }
    x = (double *)malloc(3 * (size_t)s->nv * sizeof(double));
    if (!x) exit(2);
    memcpy(x, s->v, 3 * (size_t)s->nv * sizeof(double));
    qsort(x, (size_t)s->nv, 3 * sizeof(double), by_place);
    for (i = 1; i < s->nv; i++) same += by_place(x + 3 * i - 3, x + 3 * i) == 0;
    for (i = 0; i < 6 * s->nt; i++) {       /* a vertex in the middle of an edge hangs */
        double m[3];
        for (k = 0; k < 3; k++)
            m[k] = 0.5 * (s->v[3 * s->tet[4 * (i / 6) + kdsmi_edge[i % 6][0]] + k]
                          + s->v[3 * s->tet[4 * (i / 6) + kdsmi_edge[i % 6][1]] + k]);
        halved += bsearch(m, x, (size_t)s->nv, 3 * sizeof(double), by_place) != NULL;
    }
    printf("  levels %d: %d vertices, %d red, %d green, %d dropped, %d forced; %d outer faces, "
           "least phi there %.4f of %.4f\n    volume %.6g (surface %.6g), %.3g .. %.3g; angles "
           "%.1f .. %.1f, aspect %.2f, mean %.2f\n", d->levels, s->nv, s->report.red,
           s->report.green, s->report.dropped, s->report.forced, outer, least, d->thickness,
           q.volume, volume, q.smallest, q.largest, q.angle_min, q.angle_max, q.aspect,
           q.aspect_mean);
    CHECK(bad == 0 && same == 0 && halved == 0 && q.inverted == 0 && q.smallest > 0);
    CHECK(s->nt == s->report.red + s->report.green);
    CHECK_REL(volume, q.volume, 1e-10);
    CHECK(least >= d->thickness - 0.5 * grid->cell);
    CHECK(q.angle_min > 25 && q.angle_max < 130 && q.aspect < 3);
    CHECK(d->levels < 3 || s->report.forced > 0);
    if (d->levels == 0) CHECK(q.angle_min > 59.99 && q.angle_max < 90.01 && s->report.green == 0);
    else CHECK(s->report.green > 0);
    free(list), free(x);
    cloth_grid_destroy(grid);
}

/* Two balls that touch, levels from none to four: where grades meet all patterns of green occur. */
static void mesh_hangs_together(void) {
    const double c[3] = {0.01, 0.02, 0}, c2[3] = {0.16, 0.05, 0.02};
    shape        balls;
    int          level, k, *joint;
    double      *weight;
    memset(&balls, 0, sizeof balls);
    shape_sphere(&balls, c, 0.1, 8), shape_sphere(&balls, c2, 0.06, 8);
    joint = (int *)calloc((size_t)balls.nv, sizeof(int));
    weight = (double *)malloc((size_t)balls.nv * sizeof(double));
    if (!joint || !weight) exit(2);
    for (k = 0; k < balls.nv; k++) weight[k] = 1;
    for (level = 0; level <= (test_full() ? 5 : 3); level++) {
        kdsm_desc   d = basic;
        kdsm_space *s;
        d.nv = balls.nv, d.x = balls.x, d.nf = balls.nf, d.faces = balls.faces;
        d.njoints = d.influences = 1, d.joint = joint, d.weight = weight, d.smooth = 0;
        d.levels = level, d.coarse = 0.1, d.near = 1e-3, d.cell = 0.01;
        s = make(&d);
        hangs_together(s, &d);
        kdsm_destroy(s);
    }
    hangs_together(space, &basic);
    shape_free(&balls), free(joint), free(weight);
}

/* Parts cut at random, far from how the surface would have them cut: the closure bears it. */
static void mesh_of_random_cuts_hangs_together(void) {
    int round, k;
    for (k = 0; k < (test_full() ? 8 : 3); k++) {
        kdsm_desc    d = basic;
        cloth_grid  *grid;
        kdsm_space   s;
        kdsmi_maker  m;
        size_t       i;
        memset(&s, 0, sizeof s), memset(&m, 0, sizeof m);
        d.coarse = 0.3, d.cell = 0.03, d.levels = 3;
        grid = grid_of(&d);
        m.d = &d, m.grid = grid, m.rep = &s.report;
        CHECK(kdsmi_lattice(&m) == CLOTH_OK);
        for (round = 0; round < 3; round++) {
            const size_t n = m.part.n;
            for (i = 0; i < n; i++)
                if (((kdsmi_part *)m.part.at)[i].level == round && uniform(0, 1) < 0.06)
                    CHECK(kdsmi_red(&m, i));
        }
        CHECK(kdsmi_close(&m) == CLOTH_OK && kdsmi_emit(&m, &s) == CLOTH_OK);
        hangs_together(&s, &d);
        kdsmi_maker_free(&m);
        kdsmi_free(&d.hooks, s.v), kdsmi_free(&d.hooks, s.tet), kdsmi_free(&d.hooks, s.green);
        cloth_grid_destroy(grid);
    }
}

/* Boxes [nt x 6] three times as large as each tetrahedron's: none within epsilon is beyond. */
static double *boxes_of(const kdsm_space *s, const double *x) {
    double *box = (double *)malloc(6 * (size_t)s->nt * sizeof(double));
    int     t, k;
    if (!box) exit(2);
    for (t = 0; t < s->nt; t++) {
        double a[12];
        kdsmi_corners(x, s->tet + 4 * t, a);
        for (k = 0; k < 3; k++) {
            const double lo = fmin(fmin(a[k], a[k + 3]), fmin(a[k + 6], a[k + 9]));
            const double hi = fmax(fmax(a[k], a[k + 3]), fmax(a[k + 6], a[k + 9]));
            box[6 * t + k] = lo - (hi - lo) - 1e-9, box[6 * t + 3 + k] = hi + (hi - lo) + 1e-9;
        }
    }
    return box;
}

static int beside(const double *b, const double *p) {
    return p[0] < b[0] || p[0] > b[3] || p[1] < b[1] || p[1] > b[4] || p[2] < b[2] || p[2] > b[5];
}

/* Points at random: inside of the thickened body they are in one tetrahedron, nowhere in two. */
static void mesh_covers_the_thickened_body(void) {
    cloth_grid *grid = grid_of(&basic);
    const int   n = test_full() ? 20000 : test_quick() ? 500 : 4000;
    double     *box = boxes_of(space, space->v);
    int         i, t, inside = 0, missed = 0, twice = 0;
    for (i = 0; i < n; i++) {
        const double p[3] = {uniform(-0.8, 0.8), uniform(-0.1, 1.8), uniform(-0.25, 0.3)};
        const double phi = phi_at(grid, p);
        int          in = 0, deep = 0;
        for (t = 0; t < space->nt; t++) {
            double a[12], w[4], least;
            if (beside(box + 6 * t, p)) continue;
            kdsmi_corners(space->v, space->tet + 4 * t, a);
            CHECK(kdsm_barycentric(a, p, w));
            least = fmin(fmin(w[0], w[1]), fmin(w[2], w[3]));
            in += least >= -1e-12, deep += least > 1e-12;
        }
        inside += phi < basic.thickness - 0.5 * grid->cell;
        missed += phi < basic.thickness - 0.5 * grid->cell && !in;
        twice += deep > 1;
    }
    printf("  %d of %d points inside, %d missed, %d in two tetrahedra\n", inside, n, missed, twice);
    CHECK(inside > n / 20 && missed == 0 && twice == 0);
    free(box), cloth_grid_destroy(grid);
}

/* --- weights and skinning --- */

/* The mean and worst distance of the space's own picture of the body from the body, mm. */
static void body_in_space(const kdsm_space *s, const double *pose, double *mean, double *worst) {
    const size_t n = (size_t)body.nv;
    int         *tet = (int *)malloc(n * sizeof(int)), i, outside = 0;
    double      *w = (double *)malloc(10 * n * sizeof(double)), *x = w + 4 * n, *y = x + 3 * n;
    double      *xv = (double *)malloc(3 * (size_t)s->nv * sizeof(double)), far = 0;
    if (!tet || !w || !xv) exit(2);
    CHECK(kdsm_embed(s, body.nv, body.x, tet, w, &outside, &far) == CLOTH_OK && outside == 0);
    CHECK(kdsm_skin(s, pose, 0, NULL, xv) == CLOTH_OK);
    CHECK(kdsm_evaluate(s, xv, body.nv, tet, w, x, NULL) == CLOTH_OK);
    figure_skin(&body, pose, y);
    for (i = 0, *mean = *worst = 0; i < body.nv; i++) {
        const double d = 1e3 * sqrt(kdsmi_distance2(x + 3 * i, y + 3 * i));
        *mean += d / body.nv, *worst = fmax(*worst, d);
    }
    free(tet), free(w), free(xv);
}

/* The largest difference of a joint's weight along an edge, and in the mean, of the space. */
static double steepest(const kdsm_space *s) {
    double worst = 0;
    int    t, e, j, k;
    for (t = 0; t < s->nt; t++)
        for (e = 0; e < 6; e++) {
            const int a = s->tet[4 * t + kdsmi_edge[e][0]], b = s->tet[4 * t + kdsmi_edge[e][1]];
            double    diff[SHAPES_BONES];
            memset(diff, 0, sizeof diff);
            for (k = 0; k < s->kept; k++) {
                diff[s->joint[s->kept * a + k]] += s->weight[s->kept * a + k];
                diff[s->joint[s->kept * b + k]] -= s->weight[s->kept * b + k];
            }
            for (j = 0; j < SHAPES_BONES; j++) worst = fmax(worst, fabs(diff[j]));
        }
    return worst;
}

/* The formula of [4.3] over again, from the weights without diffusion: the largest difference. */
static double diffused(const kdsm_space *raw, const kdsm_space *s, int joint) {
    const double fine = basic.coarse / (1 << basic.levels);
    const double n = ceil(6 * pow(basic.smooth / fine, 2));
    double      *w[2], *sum = (double *)calloc((size_t)s->nv, 3 * sizeof(double)), worst = 0;
    int          i, k, t, e, step;
    for (k = 0; k < 2; k++) w[k] = (double *)calloc((size_t)s->nv, sizeof(double));
    if (!w[0] || !w[1] || !sum) exit(2);
    for (i = 0; i < s->nv * s->kept; i++)
        if (raw->joint[i] == joint) w[0][i / s->kept] += raw->weight[i];
    for (step = 0; step < (int)n; step++) {
        memset(sum, 0, 3 * (size_t)s->nv * sizeof(double));
        for (t = 0; t < s->nt; t++)
            for (e = 0; e < 12; e++) {
                const int a = s->tet[4 * t + kdsmi_edge[e / 2][e % 2]];
                const int b = s->tet[4 * t + kdsmi_edge[e / 2][1 - e % 2]];
                sum[3 * a] += w[0][b], sum[3 * a + 1] += 1;
                sum[3 * a + 2] += kdsmi_distance2(s->v + 3 * a, s->v + 3 * b);
            }
        for (i = 0; i < s->nv; i++) {
            const double h2 = sum[3 * i + 2] / sum[3 * i + 1], near = s->phi[i] / basic.near;
            const double a = fmin(0.5, 3 * basic.smooth * basic.smooth / (n * h2))
                             * fmin(1, near * near);
            w[0][i] = (1 - a) * w[0][i] + a * sum[3 * i] / sum[3 * i + 1];
        }
    }
    for (i = 0; i < s->nv * s->kept; i++)
        if (s->joint[i] == joint) w[1][i / s->kept] += s->weight[i];
    for (i = 0; i < s->nv; i++) worst = fmax(worst, fabs(w[0][i] - w[1][i]));
    free(w[0]), free(w[1]), free(sum);
    return worst;
}

static void weights_are_a_partition(void) {
    kdsm_desc   d = basic;
    kdsm_space *raw;
    double      mean, worst, raw_mean, raw_worst;
    int         i, k, several = 0;
    for (i = 0; i < space->nv; i++) {
        const double *w = space->weight + space->kept * i;
        double        sum = 0;
        for (k = 0; k < space->kept; k++) {
            const int j = space->joint[space->kept * i + k];
            sum += w[k];
            CHECK(w[k] >= 0 && (k == 0 || w[k] <= w[k - 1]) && j >= 0 && j < SHAPES_BONES);
        }
        CHECK_NEAR(sum, 1, 1e-12);
        several += w[1] > 0;
    }
    d.smooth = 0;
    raw = make(&d);
    figure_pose(&body, 7, 1, T);
    body_in_space(space, T, &mean, &worst);
    body_in_space(raw, T, &raw_mean, &raw_worst);
    printf("  %d of %d vertices with several joints; largest step along an edge %.3f, %.3f without "
           "diffusion; cut %.2g\n  the body in its space: mean %.2f mm, worst %.1f; without "
           "diffusion %.2f, %.1f\n", several, space->nv, steepest(space), steepest(raw),
           space->report.cut, mean, worst, raw_mean, raw_worst);
    for (k = 1; k < 8; k += 3) CHECK_NEAR(diffused(raw, space, k), 0, 1e-6);
    CHECK(several > space->nv / 4 && space->report.cut < 0.02);
    CHECK(steepest(space) < 0.95 * steepest(raw));
    CHECK(mean < 3 && raw_mean < 1);
    kdsm_destroy(raw);
}

static void identity(double *to) {
    int i;
    memset(to, 0, sizeof T);
    for (i = 0; i < SHAPES_BONES; i++)
        to[12 * i] = to[12 * i + 5] = to[12 * i + 10] = 1;
}

static void skinning_moves_what_is_asked(void) {
    static const double R[12] = {0, -1, 0, 0.3, 1, 0, 0, -0.2, 0, 0, 1, 0.5};
    double             *x = (double *)malloc(3 * (size_t)space->nv * sizeof(double));
    int                 list[3], i, k;
    if (!x) exit(2);
    identity(T);
    CHECK(kdsm_skin(space, T, 0, NULL, x) == CLOTH_OK);
    for (i = 0; i < 3 * space->nv; i++) CHECK_NEAR(x[i], space->v[i], 1e-14);
    for (i = 0; i < SHAPES_BONES; i++) memcpy(T + 12 * i, R, sizeof R);
    list[0] = 5, list[1] = 17, list[2] = space->nv - 1;
    memset(x, 0, 3 * (size_t)space->nv * sizeof(double));
    CHECK(kdsm_skin(space, T, 3, list, x) == CLOTH_OK);
    for (i = 0; i < space->nv; i++)
        for (k = 0; k < 3; k++) {
            const double *p = space->v + 3 * i;
            const int     asked = i == 5 || i == 17 || i == space->nv - 1;
            CHECK_NEAR(x[3 * i + k], asked ? R[4 * k] * p[0] + R[4 * k + 1] * p[1]
                                             + R[4 * k + 2] * p[2] + R[4 * k + 3] : 0, 1e-14);
        }
    list[1] = space->nv;
    CHECK(kdsm_skin(space, T, 3, list, x) == CLOTH_ERR_ARGUMENT);
    T[30] = HOST_NAN;
    CHECK(kdsm_skin(space, T, 0, NULL, x) == CLOTH_ERR_NONFINITE && strstr(told.text, "T[30]"));
    host_forget(&told);
    free(x);
}

/* --- embedding --- */

static void embedding_gives_points_back(void) {
    const int n = 2000;
    int      *tet = (int *)malloc((size_t)n * sizeof(int)), i, k, outside, count = 0, *list;
    double   *u = (double *)malloc(10 * (size_t)n * sizeof(double)), *w = u + 3 * n, *x = w + 4 * n;
    double    far;
    list = (int *)malloc((size_t)space->nv * sizeof(int));
    if (!tet || !u || !list) exit(2);
    for (i = 0; i < n; i++) {               /* in a tetrahedron, on a corner, or out in the air */
        const int *v = space->tet + 4 * (int)uniform(0, space->nt);
        double     b[4], sum = 0;
        for (k = 0; k < 4; k++) sum += b[k] = i % 10 == 1 ? k == 0 : uniform(0, 1);
        for (k = 0; k < 12; k++) u[3 * i + k % 3] = k < 3 ? 0 : u[3 * i + k % 3];
        for (k = 0; k < 12; k++)
            u[3 * i + k % 3] += b[k / 3] / sum * space->v[3 * v[k / 3] + k % 3];
        if (i % 10 == 0) u[3 * i] = 2;
    }
    CHECK(kdsm_embed(space, n, u, tet, w, &outside, &far) == CLOTH_OK);
    CHECK(outside == n / 10 && far > 1 && far < 3);
    CHECK(kdsm_evaluate(space, space->v, n, tet, w, x, NULL) == CLOTH_OK);
    for (i = 0; i < n; i++) {
        const double least = fmin(fmin(w[4 * i], w[4 * i + 1]), fmin(w[4 * i + 2], w[4 * i + 3]));
        CHECK_NEAR(w[4 * i] + w[4 * i + 1] + w[4 * i + 2] + w[4 * i + 3], 1, 1e-12);
        CHECK(i % 10 == 0 ? least < 0 : least >= 0);
        for (k = 0; k < 3; k++) CHECK_NEAR(x[3 * i + k], u[3 * i + k], 1e-12);
    }
    CHECK(kdsm_needed(space, n, tet, list, &count) == CLOTH_OK && count > 0 && count < 4 * n);
    for (i = 1; i < count; i++) CHECK(list[i] > list[i - 1]);
    tet[3] = space->nt;
    CHECK(kdsm_needed(space, n, tet, list, &count) == CLOTH_ERR_ARGUMENT);
    CHECK(kdsm_evaluate(space, space->v, n, tet, w, x, NULL) == CLOTH_ERR_ARGUMENT);
    free(tet), free(u), free(list);
}

/* x of one point, embedded anew. */
static void carried(const double *xv, const double *u, double *x, double *F) {
    double w[4];
    int    tet;
    CHECK(kdsm_embed(space, 1, u, &tet, w, NULL, NULL) == CLOTH_OK);
    CHECK(kdsm_evaluate(space, xv, 1, &tet, w, x, F) == CLOTH_OK);
}

static void derivative_by_central_differences(void) {
    const double h = 1e-5;
    double      *xv = (double *)malloc(3 * (size_t)space->nv * sizeof(double)), worst = 0, big = 0;
    int          i, r, c, n = 0;
    if (!xv) exit(2);
    figure_pose(&body, 3, 1, T);
    CHECK(kdsm_skin(space, T, 0, NULL, xv) == CLOTH_OK);
    for (i = 0; i < 300; i++) {             /* the middle: no step leaves the tetrahedron */
        const int *v = space->tet + 4 * (int)uniform(0, space->nt);
        double     u[3], x[2][3], F[9], m[3];
        for (c = 0; c < 3; c++)
            u[c] = 0.25 * (space->v[3 * v[0] + c] + space->v[3 * v[1] + c] + space->v[3 * v[2] + c]
                           + space->v[3 * v[3] + c]);
        carried(xv, u, m, F);
        for (c = 0; c < 3; c++) {
            const double at = u[c];
            u[c] = at - h, carried(xv, u, x[0], NULL);
            u[c] = at + h, carried(xv, u, x[1], NULL);
            u[c] = at;
            for (r = 0; r < 3; r++) {
                const double difference = (x[1][r] - x[0][r]) / (2 * h);
                worst = fmax(worst, fabs(difference - F[3 * r + c]));
                big = fmax(big, fabs(F[3 * r + c])), n++;
            }
        }
    }
    printf("  %d entries up to %.2f, worst difference %.2g\n", n, big, worst);
    CHECK(worst < 1e-8 && big > 1.2);
    free(xv);
}

/* --- point location --- */

/* Everything in [5.2] said over again without a hierarchy. */
static int brute(const kdsm_space *s, const double *x, const double *box, const double *p,
                 kdsm_candidate *list, int *held) {
    int t, i, j, k, n = 0, left;
    for (t = 0; t < s->nt; t++) {
        double         a[12];
        kdsm_candidate c;
        if (beside(box + 6 * t, p)) continue;
        kdsmi_corners(x, s->tet + 4 * t, a);
        if (!kdsm_barycentric(a, p, c.w)) continue;
        c.tet = t, c.depth = fmin(fmin(c.w[0], c.w[1]), fmin(c.w[2], c.w[3]));
        if (c.depth < -0.05) continue;
        for (i = n++; i > 0 && list[i - 1].depth < c.depth; i--) list[i] = list[i - 1];
        list[i] = c;
    }
    *held = n;
    for (i = 0; i < n; i++) {
        int face[3], f = 0, low = 0;
        for (k = 1; k < 4; k++)
            if (list[i].w[k] < list[i].w[low]) low = k;
        for (k = 0; k < 4; k++)
            if (k != low) face[f++] = s->tet[4 * list[i].tet + k];
        for (left = j = i + 1; j < n; j++) {
            int shared = 0;
            for (k = 0; k < 12; k++) shared |= face[k / 4] == s->tet[4 * list[j].tet + k % 4];
            if (!shared) list[left++] = list[j];
        }
        n = left;
    }
    return n;
}

static void a_point_near(const kdsm_space *s, const double *x, int i, double *p) {
    const int *v = s->tet + 4 * (int)uniform(0, s->nt);
    double     b[4], sum = 0;
    int        k;
    for (k = 0; k < 4; k++) sum += b[k] = i % 3 == 0 ? uniform(-0.1, 1) : uniform(0, 1);
    if (i % 7 == 0) sum -= b[0], b[0] = 0;  /* on a face */
    for (k = 0; k < 3; k++) p[k] = 0;
    for (k = 0; k < 12; k++) p[k % 3] += b[k / 3] / sum * x[3 * v[k / 3] + k % 3];
}

static void locate_is_brute_force(void) {
    static kdsm_candidate want[4096], got[4096];
    const int   n = test_full() ? 100000 : test_quick() ? 600 : 3000, poses = 4;
    kdsm_pose  *pose = NULL;
    int         i, k, several = 0, most = 0, inverted = 0, wrong = 0, none = 0;
    clock_t     ours = 0, theirs = 0, at;
    CHECK(kdsm_pose_create(space, &pose) == CLOTH_OK);
    if (!pose) return;
    for (k = 0; k < poses; k++) {
        double *box;
        if (k % 2) arms_in(0.5 + 0.1 * k, T);
        else figure_pose(&body, (uint64_t)k + 1, 1.2, T);
        CHECK(kdsm_pose_set(pose, T) == CLOTH_OK);
        i = kdsm_measure(space, pose->x).inverted;
        printf("  pose %d: %d of %d inverted\n", k, i, space->nt);
        inverted += i;
        box = boxes_of(space, pose->x);
        for (i = 0; i < n / poses; i++) {
            double p[3];
            int    count, held, all, c;
            a_point_near(space, pose->x, i, p);
            at = clock();
            CHECK(kdsm_locate(pose, p, 4096, got, &count, &held) == CLOTH_OK);
            ours += clock() - at, at = clock();
            c = brute(space, pose->x, box, p, want, &all);
            theirs += clock() - at;
            wrong += c != count || all != held;
            if (c != count) continue;
            for (c = 0; c < count; c++)
                wrong += want[c].tet != got[c].tet
                         || memcmp(want[c].w, got[c].w, sizeof want[c].w) != 0;
            several += count > 1, none += count == 0;
            most = count > most ? count : most;
        }
        free(box);
    }
    printf("  %d points: %d with several candidates, at most %d, %d with none; %d wrong; %.2f us a "
           "point, by brute force %.0f\n", n, several, most, none, wrong,
           1e6 * (double)ours / CLOCKS_PER_SEC / n, 1e6 * (double)theirs / CLOCKS_PER_SEC / n);
    CHECK(wrong == 0 && several > n / 100 && inverted > 0);
    kdsm_pose_destroy(pose);
}

/* Weights of random tetrahedra, flat ones among them, in long double. */
static void barycentric_in_long_double(void) {
    double worst = 0;
    int    i, j, k, flat = 0;
    if (!test_long_double()) SKIP("long double is double");
    for (i = 0; i < 20000; i++) {
        double      a[12], p[3], w[4], squash = pow(10, -uniform(0, 8));
        long double sum;
        for (j = 0; j < 12; j++) a[j] = uniform(-1, 1) * (j % 3 == 2 ? squash : 1);
        for (k = 0; k < 3; k++) p[k] = uniform(-1, 1) * (k == 2 ? squash : 1);
        if (!kdsm_barycentric(a, p, w)) {
            flat++;
            continue;
        }
        for (k = 0; k < 3; k++) {
            for (sum = 0, j = 0; j < 4; j++) sum += (long double)w[j] * (long double)a[3 * j + k];
            worst = fmax(worst, fabs((double)(sum - (long double)p[k]))
                                / (1 + fabs(w[0]) + fabs(w[1]) + fabs(w[2]) + fabs(w[3])));
        }
        CHECK_NEAR(w[0] + w[1] + w[2] + w[3], 1, 1e-13 * (1 + fabs(w[0]) + fabs(w[1])));
    }
    printf("  %d flat; p from its weights to %.2g of their size\n", flat, worst);
    CHECK(worst < 1e-15 * 4 && flat < 20000);
}

/* --- displacements --- */

static shapes_shirt shirt;
static kdsm_cloth  *cloth;                  /* the shirt in the space                          */
static kdsm_pose   *posed;

/* What a solver would give, without a solver: the shirt carried by the space, with wrinkles. */
static void wrinkled(int k, double *x) {
    int i;
    if (k % 2) arms_in(0.35 + 0.1 * k, T);
    else figure_pose(&body, (uint64_t)k + 20, 1, T);
    CHECK(kdsm_pose_set(posed, T) == CLOTH_OK);
    CHECK(kdsm_place(cloth, T, NULL, x, NULL) == CLOTH_OK);
    for (i = 0; i < 3 * shirt.nv; i++)
        x[i] += 0.006 * sin(70 * shirt.x[3 * (i / 3)] + i % 3 + k)
                * cos(50 * shirt.x[3 * (i / 3) + 1]);
}

static kdsm_displace_report displaced(const double *x, kdsm_method method, double *d,
                                      int *origin) {
    kdsm_displace_report r;
    kdsm_options         o = kdsm_options_default();
    o.method = method, o.seed = 5;
    CHECK(kdsm_displace(cloth, posed, x, &o, d, origin, &r) == CLOTH_OK);
    return r;
}

static double *vectors(int n) {
    double *x = (double *)calloc((size_t)n, 3 * sizeof(double));
    if (!x) exit(2);
    return x;
}

/* x -> d -> x by separate calls, for every vertex that a tetrahedron truly holds. */
static void round_trip_is_exact_where_held(void) {
    double *x = vectors(4 * shirt.nv), *d = x + 3 * shirt.nv, *d2 = d + 3 * shirt.nv;
    double *y = d2 + 3 * shirt.nv, worst = 0, largest = 0;
    int     i, k, count, held = 0, several = 0, epsilon = 0, none = 0;
    for (k = 0; k < 6; k++) {
        kdsm_displace_report r;
        kdsm_candidate       c;
        wrinkled(k, x);
        r = displaced(x, KDSM_RANDOM, d, NULL);
        CHECK(kdsm_place(cloth, T, d, y, NULL) == CLOTH_OK);
        for (i = 0; i < shirt.nv; i++) {
            CHECK(kdsm_locate(posed, x + 3 * i, 1, &c, &count, NULL) == CLOTH_OK);
            if (count == 0 || c.depth < 0) continue;
            worst = fmax(worst, sqrt(kdsmi_distance2(x + 3 * i, y + 3 * i))), held++;
        }
        CHECK(r.held_max < 1e-9 && r.none + r.one + r.several == shirt.nv);
        several += r.several, epsilon += r.epsilon, none += r.none;
        largest = fmax(largest, r.d_max);
        (void)displaced(x, KDSM_RANDOM, d2, NULL);
        CHECK(memcmp(d, d2, 3 * (size_t)shirt.nv * sizeof(double)) == 0);
    }
    printf("  %d of %d held, worst %.2g m; %d with several, %d by the margin, %d by none; |d| to "
           "%.3f m\n", held, 6 * shirt.nv, worst, several, epsilon, none, largest);
    CHECK(worst < 1e-9 && several > 0 && held > 5 * shirt.nv);
    CHECK(held + epsilon + none == 6 * shirt.nv);
    free(x);
}

/* The body as its own cloth: offsets from the surface are 0 there, in every pose. */
static void surface_of_the_body_is_at_rest(void) {
    kdsm_cloth          *skin = NULL;
    kdsm_options         o = kdsm_options_default();
    kdsm_displace_report r;
    double              *d = vectors(body.nv);
    int                  i, far = 0;
    CHECK(kdsm_cloth_create(space, body.nv, body.x, body.nf, body.faces, &skin) == CLOTH_OK);
    if (!skin) return;
    o.method = KDSM_SURFACE;
    figure_pose(&body, 4, 0.5, T);
    CHECK(kdsm_pose_set(posed, T) == CLOTH_OK);
    CHECK(kdsm_displace(skin, posed, posed->body, &o, d, NULL, &r) == CLOTH_OK);
    for (i = 0; i < body.nv; i++) far += !(sqrt(kdsmi_dot(d + 3 * i, d + 3 * i)) < 1e-12);
    printf("  %d of %d vertices not at rest\n", far, body.nv);
    CHECK(far == 0 && r.origin[KDSM_FROM_SURFACE] == body.nv);
    kdsm_cloth_destroy(skin);
    free(d);
}

/* Carried to rest: where d of method 2 says; carried back: x, if the nearest point is the same. */
static void carry_is_method_2(const double *x, const double *d) {
    double    *y = vectors(shirt.nv), worst = 0;
    kdsm_pose *rest = NULL;
    int        i, back = 0;
    CHECK(kdsm_pose_create(space, &rest) == CLOTH_OK);
    if (!rest) return;
    CHECK(kdsm_carry(posed, rest, shirt.nv, x, y) == CLOTH_OK);
    for (i = 0; i < 3 * shirt.nv; i++) worst = fmax(worst, fabs(y[i] - shirt.x[i] - d[i]));
    CHECK(worst < 1e-12);
    CHECK(kdsm_carry(rest, posed, shirt.nv, y, y) == CLOTH_OK);
    for (i = 0; i < shirt.nv; i++) back += kdsmi_distance2(y + 3 * i, x + 3 * i) < 25e-8;
    printf("  there and back: %d of %d within 0.5 of 1 mm\n", back, shirt.nv);
    CHECK(back > shirt.nv * 9 / 10);
    CHECK(kdsm_carry(rest, posed, -1, y, y) == CLOTH_ERR_ARGUMENT);
    kdsm_pose_destroy(rest), free(y);
}

/* A point `off` along a face's normal has the offset `off` at rest. */
static void surface_keeps_the_offset(void) {
    double *x = vectors(3 * shirt.nv), *d = x + 3 * shirt.nv, n[3], e[2][3], worst = 0;
    int     i, k, flat = 0;
    figure_pose(&body, 4, 0.3, T);
    CHECK(kdsm_pose_set(posed, T) == CLOTH_OK);
    for (i = 0; i < shirt.nv; i++) {
        const int *f = body.faces + 3 * (i * 7 % body.nf);
        for (k = 0; k < 2; k++)
            kdsmi_sub(posed->body + 3 * f[k + 1], posed->body + 3 * f[0], e[k]);
        kdsmi_cross(e[0], e[1], n);
        for (k = 0; k < 3; k++)
            x[3 * i + k] = (posed->body[3 * f[0] + k] + posed->body[3 * f[1] + k]
                            + posed->body[3 * f[2] + k]) / 3
                           + 1e-3 * n[k] / sqrt(kdsmi_dot(n, n));
    }
    (void)displaced(x, KDSM_SURFACE, d, NULL);
    for (i = 0; i < shirt.nv; i++) {        /* normals of vertices lean: at most 1 mm of 1 mm */
        const int *f = body.faces + 3 * (i * 7 % body.nf);
        double     m[3], off;
        for (k = 0; k < 2; k++) kdsmi_sub(body.x + 3 * f[k + 1], body.x + 3 * f[0], e[k]);
        kdsmi_cross(e[0], e[1], n);
        for (k = 0; k < 3; k++)
            m[k] = shirt.x[3 * i + k] + d[3 * i + k]
                   - (body.x[3 * f[0] + k] + body.x[3 * f[1] + k] + body.x[3 * f[2] + k]) / 3;
        off = kdsmi_dot(m, n) / sqrt(kdsmi_dot(n, n));      /* on the same side */
        worst = fmax(worst, fabs(off - 1e-3)), flat += fabs(off - 1e-3) < 1e-4;
    }
    printf("  offsets of 1 mm: %d of %d within 0.1 mm, worst off by %.2g m\n", flat, shirt.nv,
           worst);
    CHECK(flat > shirt.nv * 9 / 10);
    carry_is_method_2(x, d);
    free(x);
}

/* Every origin keeps its promise. */
static void hybrid_takes_what_it_says(void) {
    double *x = vectors(5 * shirt.nv), *d = x + 3 * shirt.nv, *d2 = d + 3 * shirt.nv;
    double *d1 = d2 + 3 * shirt.nv, *y = d1 + 3 * shirt.nv;
    int    *origin = (int *)calloc((size_t)shirt.nv, sizeof(int)), i, k, seen[6] = {0};
    if (!origin) exit(2);
    for (k = 0; k < 6; k++) {
        kdsm_displace_report r;
        wrinkled(k, x);
        (void)displaced(x, KDSM_SURFACE, d2, NULL);
        (void)displaced(x, KDSM_RANDOM, d1, NULL);
        r = displaced(x, KDSM_HYBRID, d, origin);
        CHECK(kdsm_place(cloth, T, d, y, NULL) == CLOTH_OK);
        for (i = 0; i < shirt.nv; i++) {
            const double off = sqrt(kdsmi_distance2(d + 3 * i, d2 + 3 * i));
            kdsm_candidate c;
            int            count;
            CHECK(kdsm_locate(posed, x + 3 * i, 1, &c, &count, NULL) == CLOTH_OK);
            if (origin[i] == KDSM_FROM_ONE)
                CHECK(memcmp(d + 3 * i, d1 + 3 * i, 3 * sizeof(double)) == 0);
            if (origin[i] == KDSM_FROM_CHOICE) CHECK(off <= 0.01 + 1e-12);
            if (origin[i] == KDSM_FROM_MORPH) CHECK(off <= 0.02 + 1e-12);
            CHECK(origin[i] != KDSM_FROM_SURFACE && (count > 0 || origin[i] == KDSM_FROM_REST));
            if (origin[i] < KDSM_FROM_REST && c.depth >= 0)
                CHECK(sqrt(kdsmi_distance2(x + 3 * i, y + 3 * i)) < 1e-9);
            seen[origin[i]]++;
        }
        for (i = 1; i < 6; i++) seen[0] += r.origin[i];
    }
    printf("  only one %d, of several %d, beside the morph %d, morphed %d\n", seen[1], seen[2],
           seen[3], seen[4]);
    CHECK(seen[0] == 6 * shirt.nv && seen[1] > 0 && seen[2] > 0 && seen[4] > 0);
    free(x), free(origin);
}

/* c_ij again: Laplace's equation at every vertex that was morphed. */
static void hybrid_morph_is_harmonic(void) {
    double *x = vectors(4 * shirt.nv), *d = x + 3 * shirt.nv, *d2 = d + 3 * shirt.nv;
    double *sum = d2 + 3 * shirt.nv, worst = 0, most = 0;
    int    *origin = (int *)calloc((size_t)shirt.nv, sizeof(int)), f, i, k, n = 0;
    if (!origin) exit(2);
    wrinkled(5, x);
    (void)displaced(x, KDSM_SURFACE, d2, NULL);
    (void)displaced(x, KDSM_HYBRID, d, origin);
    for (i = 0; i < 3 * shirt.nv; i++) d[i] -= d2[i];
    for (f = 0; f < shirt.nf; f++)
        for (k = 0; k < 3; k++) {
            const int    *v = shirt.faces + 3 * f, a = v[(k + 1) % 3], b = v[(k + 2) % 3];
            const double *p = shirt.x + 3 * v[k], *q = shirt.x + 3 * a, *r = shirt.x + 3 * b;
            const double  pq = kdsmi_distance2(p, q), pr = kdsmi_distance2(p, r);
            const double  cosine = (pq + pr - kdsmi_distance2(q, r)) / (2 * sqrt(pq * pr));
            const double  c = 0.5 * fmin(fmax(cosine / sqrt(1 - cosine * cosine), 0.05), 20);
            for (i = 0; i < 3; i++) {
                sum[3 * a + i] += c * (d[3 * a + i] - d[3 * b + i]);
                sum[3 * b + i] += c * (d[3 * b + i] - d[3 * a + i]);
            }
        }
    for (i = 0; i < 3 * shirt.nv; i++) {
        if (origin[i / 3] != KDSM_FROM_REST) continue;
        worst = fmax(worst, fabs(sum[i])), most = fmax(most, fabs(d[i])), n++;
    }
    printf("  %d unknowns up to %.3f m, residual %.2g m\n", n, most, worst);
    CHECK(n > 0 && most > 1e-3 && worst < 1e-8);
    free(x), free(origin);
}

/* The ordering of the paper's table 1, and the report against sums of our own. */
static void orders_of_the_paper(void) {
    static const char   *name[] = {"method 1", "method 2", "hybrid"};
    kdsm_displace_report all[3], r;
    double              *x = vectors(3 * shirt.nv), *d = x + 3 * shirt.nv, *y = d + 3 * shirt.nv;
    int                  k, m, i;
    memset(all, 0, sizeof all);
    for (k = 0; k < 6; k++)
        for (m = 0; m < 3; m++) {
            double mean = 0, worst = 0, size = 0;
            wrinkled(k, x);
            r = displaced(x, (kdsm_method)(m + 1), d, NULL);
            CHECK(kdsm_place(cloth, T, d, y, NULL) == CLOTH_OK);
            for (i = 0; i < shirt.nv; i++) {
                const double e = sqrt(kdsmi_distance2(x + 3 * i, y + 3 * i));
                mean += e / shirt.nv, worst = fmax(worst, e);
                size += sqrt(kdsmi_dot(d + 3 * i, d + 3 * i)) / shirt.nv;
            }
            CHECK_NEAR(r.error_mean, mean, 1e-12);
            CHECK_NEAR(r.error_max, worst, 1e-12);
            CHECK_NEAR(r.d_mean, size, 1e-12);
            all[m].error_mean += r.error_mean / 6, all[m].d_mean += r.d_mean / 6;
            all[m].error_max = fmax(all[m].error_max, r.error_max);
            all[m].d_max = fmax(all[m].d_max, r.d_max);
        }
    for (m = 0; m < 3; m++)
        printf("  %s: error max %.4f mean %.5f, |d| max %.4f mean %.5f m\n", name[m],
               all[m].error_max, all[m].error_mean, all[m].d_max, all[m].d_mean);
    CHECK(all[0].error_mean < all[2].error_mean && all[2].error_mean < all[1].error_mean);
    CHECK(all[0].d_max >= all[2].d_max && all[0].d_mean > all[2].d_mean);
    free(x);
}

static void placing_in_place_and_outside(void) {
    double           *x = vectors(3 * shirt.nv), *y = x + 3 * shirt.nv, *d = y + 3 * shirt.nv;
    kdsm_place_report r;
    int               i;
    figure_pose(&body, 2, 1, T);
    CHECK(kdsm_pose_set(posed, T) == CLOTH_OK);
    CHECK(kdsm_place(cloth, T, NULL, x, &r) == CLOTH_OK);
    CHECK(r.outside == cloth->outside && r.skinned > 0 && r.skinned < space->nv);
    CHECK(kdsm_evaluate(space, posed->x, shirt.nv, cloth->tet, cloth->w, y, NULL) == CLOTH_OK);
    CHECK(memcmp(x, y, 3 * (size_t)shirt.nv * sizeof(double)) == 0);
    CHECK(kdsm_place(cloth, T, d, d, NULL) == CLOTH_OK);
    CHECK(memcmp(x, d, 3 * (size_t)shirt.nv * sizeof(double)) == 0);
    for (i = 0; i < 3 * shirt.nv; i++) d[i] = i % 3 == 0 ? 1 : 0;
    CHECK(kdsm_place(cloth, T, d, x, &r) == CLOTH_OK);
    CHECK(r.outside > shirt.nv / 2 && r.farthest > 0.2 && r.farthest < 1.5);
    d[7] = HOST_NAN;
    CHECK(kdsm_place(cloth, T, d, x, &r) == CLOTH_ERR_NONFINITE && strstr(told.text, "d[7]"));
    host_forget(&told);
    free(x);
}

/* A scanned body, 31 joints, a T-shirt that fits it, two seconds into a walk. */
static void scanned_body_and_shirt(void) {
    char                 path[4][1024];
    static const char   *name[4] = {"data/body/body.obj", "data/body/weights_cmu.txt",
                                    "data/motion/walk_02_01.skin",
                                    "data/garments/tshirt_f_clean.obj"};
    static kdsm_candidate want[256], got[256];
    figure               f;
    cloth_mesh          *shirt_f = NULL;
    kdsm_desc            d;
    kdsm_space          *s;
    kdsm_pose           *p = NULL;
    kdsm_cloth          *c = NULL;
    kdsm_options         o = kdsm_options_default();
    kdsm_displace_report r;
    double              *x, *y, *box, M[12 * 31];
    int                  i, k, count, held, all, wrong = 0;
    if (test_quick()) SKIP("a scanned body: not in quick");
    for (i = 0; i < 4; i++) strcpy(path[i], test_shared(name[i]));
    if (!*path[0] || !*path[1] || !*path[2] || !*path[3]) SKIP("no shared data");
    CHECK(figure_load(path[0], path[1], path[2], &f) == NULL && f.njoints == 31);
    CHECK(cloth_obj_load(NULL, path[3], NULL, &shirt_f) == CLOTH_OK);
    d = kdsm_desc_default(), d.hooks = basic.hooks;
    figure_body(&f, &d);
    s = make(&d);
    hangs_together(s, &d);
    CHECK(kdsm_pose_create(s, &p) == CLOTH_OK);
    CHECK(kdsm_cloth_create(s, shirt_f->nv, shirt_f->x, shirt_f->nf, shirt_f->faces, &c)
          == CLOTH_OK);
    x = vectors(2 * shirt_f->nv), y = x + 3 * shirt_f->nv;
    figure_walk(&f, 2, M);
    CHECK(kdsm_pose_set(p, M) == CLOTH_OK && kdsm_place(c, M, NULL, x, NULL) == CLOTH_OK);
    for (i = 0; i < 3 * shirt_f->nv; i++) x[i] += 0.004 * sin(90 * shirt_f->x[i - i % 3] + i % 3);
    for (k = 1; k <= 3; k++) {
        o.method = (kdsm_method)k;
        CHECK(kdsm_displace(c, p, x, &o, y, NULL, &r) == CLOTH_OK);
        printf("  method %d: %d none, %d one, %d several, %d by the margin; held to %.2g m; error "
               "max %.4f mean %.5f, |d| max %.3f mean %.4f m\n", k, r.none, r.one, r.several,
               r.epsilon, r.held_max, r.error_max, r.error_mean, r.d_max, r.d_mean);
        CHECK(r.held_max < 1e-9 && r.none + r.epsilon < shirt_f->nv / 100);
    }
    CHECK(c->outside == 0);
    box = boxes_of(s, p->x);
    for (i = 0; i < 200; i++) {
        count = held = 0;
        CHECK(kdsm_locate(p, x + 3 * (i * 25), 256, got, &count, &held) == CLOTH_OK);
        wrong += brute(s, p->x, box, x + 3 * (i * 25), want, &all) != count || all != held;
        for (k = 0; k < count; k++) wrong += got[k].tet != want[k].tet;
    }
    CHECK(wrong == 0);
    kdsm_cloth_destroy(c), kdsm_pose_destroy(p), kdsm_destroy(s);
    cloth_mesh_destroy(NULL, shirt_f), figure_free(&f), free(x), free(box);
}

/* --- refusals, memory --- */

static void refuse(const kdsm_desc *d, cloth_status want, const char *word) {
    kdsm_space        *s = space;
    const int          live = told.live;
    const cloth_status status = kdsm_create(d, &s);
    if (status != want || s || told.live != live || (word && !strstr(told.text, word)))
        printf("  %s: %s\n  %s", word ? word : "", cloth_status_text(status), told.text);
    CHECK(status == want && !s && told.live == live && (!word || strstr(told.text, word)));
    host_forget(&told);
}

static void refusals_of_the_desc(void) {
    kdsm_desc   d = basic;
    kdsm_space *none = NULL;
    double      w = body.weight[41], at = body.x[30];
    d.cookie = 0, refuse(&d, CLOTH_ERR_UNINIT, NULL), d = basic;
    d.nv = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "nv"), d = basic;
    d.nf = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "nf"), d = basic;
    d.njoints = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "njoints"), d = basic;
    d.njoints = 5, refuse(&d, CLOTH_ERR_ARGUMENT, "njoints = 5"), d = basic;
    d.influences = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "influences"), d = basic;
    d.coarse = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "coarse"), d = basic;
    d.coarse = HOST_NAN, refuse(&d, CLOTH_ERR_NONFINITE, "coarse"), d = basic;
    d.coarse = 1e-3, d.cell = 0.02, d.near = 1e-3, d.smooth = 0;
    refuse(&d, CLOTH_ERR_CAPACITY, "coarse"), d = basic;
    d.levels = 7, refuse(&d, CLOTH_ERR_ARGUMENT, "levels"), d = basic;
    d.thickness = -1, refuse(&d, CLOTH_ERR_ARGUMENT, "thickness"), d = basic;
    d.near = 0.5, refuse(&d, CLOTH_ERR_ARGUMENT, "near"), d = basic;
    d.smooth = -1, refuse(&d, CLOTH_ERR_ARGUMENT, "smooth"), d = basic;
    d.kept = 0, refuse(&d, CLOTH_ERR_ARGUMENT, "kept"), d = basic;
    d.epsilon = 2, refuse(&d, CLOTH_ERR_ARGUMENT, "epsilon"), d = basic;
    d.x = NULL, refuse(&d, CLOTH_ERR_ARGUMENT, "x"), d = basic;
    d.joint = NULL, refuse(&d, CLOTH_ERR_ARGUMENT, "joint"), d = basic;
    d.weight = NULL, refuse(&d, CLOTH_ERR_ARGUMENT, "weight"), d = basic;
    d.nf--, refuse(&d, CLOTH_ERR_MESH, "closed"), d = basic;
    body.shape.weight[41] = HOST_NAN, refuse(&d, CLOTH_ERR_NONFINITE, "weight[41]");
    body.shape.weight[41] = -0.5, refuse(&d, CLOTH_ERR_ARGUMENT, "weight -0.5");
    body.shape.weight[41] = w;
    body.shape.x[30] = HOST_NAN, refuse(&d, CLOTH_ERR_NONFINITE, "x[30]");
    body.shape.x[30] = at;
    CHECK(kdsm_create(NULL, &none) == CLOTH_ERR_ARGUMENT && !none);
    CHECK(kdsm_create(&d, NULL) == CLOTH_ERR_ARGUMENT);
}

static void refusals_of_the_calls(void) {
    double         *x = vectors(2 * shirt.nv), *d = x + 3 * shirt.nv;
    kdsm_options    o = kdsm_options_default();
    kdsm_cloth     *c = NULL;
    kdsm_candidate  found;
    int             n, face[3] = {0, 1, 900};
    const double    p[3] = {0, HOST_NAN, 0};
    host_forget(&told);
    CHECK(kdsm_cloth_create(space, 0, x, 1, face, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(kdsm_cloth_create(space, 9, x, 1, face, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(strstr(told.text, "faces[2] = 900") != NULL);
    CHECK(kdsm_cloth_create(space, 9, NULL, 1, face, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(kdsm_locate(posed, p, 1, &found, &n, NULL) == CLOTH_ERR_NONFINITE && n == 0);
    CHECK(strstr(told.text, "p[1]") != NULL);
    CHECK(kdsm_locate(posed, shirt.x, -1, &found, &n, NULL) == CLOTH_ERR_ARGUMENT);
    o.accept = 0;
    CHECK(kdsm_displace(cloth, posed, x, &o, d, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    o.accept = 0.01, o.method = (kdsm_method)4;
    CHECK(kdsm_displace(cloth, posed, x, &o, d, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    o.cookie = 0;
    CHECK(kdsm_displace(cloth, posed, x, &o, d, NULL, NULL) == CLOTH_ERR_UNINIT);
    x[5] = HOST_INFINITY;
    CHECK(kdsm_displace(cloth, posed, x, NULL, d, NULL, NULL) == CLOTH_ERR_NONFINITE);
    CHECK(strstr(told.text, "x[5]") != NULL);
    CHECK(kdsm_displace(NULL, posed, x, NULL, d, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(kdsm_pose_set(posed, NULL) == CLOTH_ERR_ARGUMENT);
    kdsm_destroy(NULL), kdsm_pose_destroy(NULL), kdsm_cloth_destroy(NULL);
    host_forget(&told);
    free(x);
}

/* What is beyond 1e30 is refused by its name; up to there all is finite. */
static void refusals_of_what_is_far(void) {
    const double *u = cloth->u;
    double       *x = vectors(2 * shirt.nv), *d = x + 3 * shirt.nv, M[12 * SHAPES_BONES], w[4];
    kdsm_cloth   *c = NULL;
    int           way, i, n, tet;
    identity(M);
    for (way = 0; way < 2; way++) {
        const double       far = way ? -1.0001e30 : 1e30;
        const cloth_status want = way ? CLOTH_ERR_ARGUMENT : CLOTH_OK;
        const double       p[3] = {0, far, 0};
        host_forget(&told);
        memset(d, 0, 3 * (size_t)shirt.nv * sizeof *d), d[4] = far;
        CHECK(kdsm_place(cloth, M, d, x, NULL) == want);
        CHECK((strstr(told.text, "d[4]") != NULL) == way);
        for (i = 0; i < 3 * shirt.nv; i++) CHECK(kdsmi_finite(x[i]));
        memcpy(x, u, 3 * (size_t)shirt.nv * sizeof *x), x[7] = far;
        CHECK(kdsm_displace(cloth, posed, x, NULL, d, NULL, NULL) == want);
        CHECK((strstr(told.text, "x[7]") != NULL) == way);
        for (i = 0; i < 3 * shirt.nv; i++) CHECK(kdsmi_finite(d[i]));
        CHECK(kdsm_embed(space, 1, p, &tet, w, NULL, NULL) == want);
        CHECK(kdsm_cloth_create(space, shirt.nv, x, shirt.nf, shirt.faces, &c) == want);
        kdsm_cloth_destroy(c), c = NULL;
        CHECK(kdsm_locate(posed, p, 0, NULL, &n, NULL) == want && n == 0);
        CHECK(kdsm_carry(posed, posed, shirt.nv, x, d) == want);
        M[12 * 4] = far;
        CHECK(kdsm_pose_set(posed, M) == want && (strstr(told.text, "T[48]") != NULL) == way);
        if (!way) CHECK(kdsm_displace(cloth, posed, u, NULL, d, NULL, NULL) == CLOTH_OK);
        for (i = 0; i < 3 * shirt.nv; i++) CHECK(kdsmi_finite(d[i]));
        M[12 * 4] = 1;
    }
    CHECK(kdsm_pose_set(posed, M) == CLOTH_OK);
    host_forget(&told);
    free(x);
}

/* A tetrahedron with two joints as the body, fails at every allocation in turn. */
static void memory_fails_and_nothing_leaks(void) {
    static const double x[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const int    faces[12] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
    static const int    joint[8] = {0, 1, 0, 1, 0, 1, 0, 1};
    static const double weight[8] = {1, 0, 0.5, 0.5, 0, 1, 1, 1};
    static const double u[12] = {0.3, 0.3, 0.3, 0.5, 0.1, 0.4, 0.2, 0.6, 0.3, 0.4, 0.4, 0.4};
    static const int    face[6] = {0, 1, 2, 1, 3, 2};
    double              M[24], d[12];
    kdsm_desc           desc = kdsm_desc_default();
    int                 n, bad = 0, tries = 0;
    host                h;
    desc.hooks = host_hooks(&h);
    desc.nv = 4, desc.x = x, desc.nf = 4, desc.faces = faces, desc.njoints = 2;
    desc.influences = 2, desc.joint = joint, desc.weight = weight;
    desc.coarse = 0.5, desc.thickness = 0.1, desc.near = 0.05, desc.smooth = 0.2;
    memset(M, 0, sizeof M);
    M[0] = M[5] = M[10] = M[12] = M[21] = 1, M[18] = -1, M[15] = 0.4;   /* a quarter about x */
    for (n = 1; n < 400; n++, tries++) {
        kdsm_space  *s = NULL;
        kdsm_pose   *p = NULL;
        kdsm_cloth  *c = NULL;
        cloth_status status;
        h.calls = 0, h.fail_at = n;
        host_forget(&h);
        status = kdsm_create(&desc, &s);
        if (!status) status = kdsm_pose_create(s, &p);
        if (!status) status = kdsm_cloth_create(s, 4, u, 2, face, &c);
        if (!status) status = kdsm_pose_set(p, M);
        if (!status) status = kdsm_displace(c, p, u, NULL, d, NULL, NULL);
        if (!status) status = kdsm_place(c, M, d, d, NULL);
        bad += status && (status != CLOTH_ERR_MEMORY || h.errors == 0);
        kdsm_cloth_destroy(c), kdsm_pose_destroy(p), kdsm_destroy(s);
        bad += h.live != 0;
        if (!status) break;
    }
    printf("  %d failing calls, %d badly told\n", tries, bad);
    CHECK(bad == 0 && tries > 40 && tries < 399);
}

/* --- data and learning --- */

static size_t file_bytes(const char *path, unsigned char *to, size_t most) {
    FILE        *f = fopen(path, "rb");
    const size_t n = f ? fread(to, 1, most, f) : 0;
    if (f) fclose(f);
    return n;
}

static int test_out(void) {
    FILE *f = fopen("out/kdsm.tmp", "wb");
    if (!f) return 0;
    fclose(f), (void)remove("out/kdsm.tmp");
    return 1;
}

/* One run, two shards and, in the long tier, a run that was broken off leave the same file. */
static void shards_merge_to_the_same_bytes(void) {
    static unsigned char was[1 << 20], is[1 << 20];
    job                  j;
    size_t               n;
    int                  way;
    if (test_quick()) SKIP("a simulation: not in quick");
    if (!test_out()) SKIP("there is no directory out");
    memset(was, 0, sizeof was);
    j = chains_job("out/test_");
    j.edge = 0.05, j.poses = 1, j.steps = 6, j.chains = j.moves = 1, j.move = 12, j.every = 6;
    CHECK(chains_dress(&j) == NULL);
    for (way = 0; way < (test_full() ? 3 : 2); way++) {
        if (way < 2) chains_forget(&j);
        else (void)remove("out/test_chain_00001.done");
        j.shards = way == 1 ? 2 : 1;
        for (j.shard = j.shards - 1; j.shard >= 0; j.shard--) CHECK(chains_make(&j) == NULL);
        CHECK(chains_merge(&j) == NULL);
        n = file_bytes("out/test_data", way ? is : was, sizeof was);
        CHECK(n > 1000 && n < sizeof was);
        if (way) CHECK(memcmp(was, is, sizeof was) == 0);
        memset(is, 0, sizeof is);
    }
    chains_forget(&j), (void)remove("out/test_data");
    chains_free(&j);
}

/* A finished chain of two examples, made up. */
static void chain_made_up(int chain, int njoints, int nv) {
    const double numbers[48] = {0};
    char         path[1000];
    int          id[2] = {0, 0}, good;
    job          j = chains_job("out/test_");
    FILE        *f;
    chains_part(&j, chain, "done", path);
    f = fopen(path, "wb");
    good = f && data_write_head(f, njoints, nv, 2, 0, numbers);
    for (id[0] = chain; id[1] < 2 && good; id[1]++)
        good = data_write(f, njoints, nv, id, numbers, numbers);
    if (!good || fclose(f)) exit(2);
}

static int merge_says(job *j, const char *path, const char *word) {
    const char *error = chains_merge(j);
    if (!error || !strstr(error, path) || !strstr(error, word))
        printf("  %s %s: %s\n", path, word, error ? error : "nothing");
    return error && strstr(error, path) && strstr(error, word);
}

/* A merge that cannot be leaves what was merged before, and says which chain is why. */
static void merge_keeps_what_is_there(void) {
    static unsigned char was[8192], is[8192];
    job                  j = chains_job("out/test_");
    size_t               n;
    if (!test_out()) SKIP("there is no directory out");
    chain_made_up(0, 1, 2), chain_made_up(1, 1, 2);
    CHECK(chains_merge(&j) == NULL);
    n = file_bytes("out/test_data", was, sizeof was);
    CHECK(n == 24 + 48 + 4 * (8 + 192 + 48));
    j.chains = 3;
    CHECK(merge_says(&j, "out/test_chain_00002.done", "cannot be opened"));
    chain_made_up(2, 2, 2);
    CHECK(merge_says(&j, "out/test_chain_00002.done", "2 joints and 2 vertices, chain 0 1 and 2"));
    chain_made_up(2, 1, 3);
    CHECK(merge_says(&j, "out/test_chain_00002.done", "1 joints and 3 vertices, chain 0 1 and 2"));
    CHECK(file_bytes("out/test_data", is, sizeof is) == n && memcmp(was, is, n) == 0);
    chains_forget(&j), (void)remove("out/test_data");
}

/* A file is as long as its head says. */
static void data_of_more_than_its_head_says(void) {
    data_set s;
    FILE    *f;
    if (!test_out()) SKIP("there is no directory out");
    memset(&s, 0, sizeof s);
    chain_made_up(0, 1, 2);
    CHECK(data_read("out/test_chain_00000.done", &s) == NULL && s.n == 2);
    f = fopen("out/test_chain_00000.done", "ab");
    if (!f || fputc(0, f) == EOF || fclose(f)) exit(2);
    CHECK(data_read("out/test_chain_00000.done", &s) != NULL && s.n == 0);
    data_free(&s), (void)remove("out/test_chain_00000.done");
}

/* The first motion says how many joints there are, with room for as many. */
static void motions_have_the_same_joints(void) {
    static const float zero[48] = {0};
    const char        *error;
    figure             f;
    int                k;
    if (!test_out()) SKIP("there is no directory out");
    memset(&f, 0, sizeof f);
    for (k = 0; k < 3; k++) {
        const uint32_t head[6] = {0, 0, 2, k == 1 ? 2u : 1u, 120, 0};
        const size_t   n = 12 * head[2] * head[3];
        FILE          *out = fopen("out/test_motion", "wb");
        if (!out || fwrite(head, 4, 6, out) != 6 || fwrite(zero, 4, n, out) != n || fclose(out))
            exit(2);
        error = figure_read_motion("out/test_motion", &f);
        CHECK(k == 1 ? error && strstr(error, "out/test_motion: a motion of 2 joints, the body has"
                                              " 1") : error == NULL);
        CHECK(f.njoints == 1);
    }
    figure_free(&f), (void)remove("out/test_motion");
}

/* A body would be nowhere where it has no joint: the first such vertex is named. */
static void weights_of_every_vertex(void) {
    static const char *const text[2] = {"# two\n0 0 0.5\n1 0 1\n", "0 0 1\n1 0 0\n"};
    int                      joint[2 * FIGURE_INFLUENCES], k;
    if (!test_out()) SKIP("there is no directory out");
    for (k = 0; k < 2; k++) {
        double      weight[2 * FIGURE_INFLUENCES] = {0};
        const char *error;
        figure      f;
        FILE       *out = fopen("out/test_weights", "w");
        if (!out || fputs(text[k], out) < 0 || fclose(out)) exit(2);
        memset(&f, 0, sizeof f);
        f.nv = 2, f.njoints = 1, f.own_joint = joint, f.own_weight = weight;
        error = figure_read_weights("out/test_weights", &f);
        CHECK(k == 0 ? error == NULL
                     : error && strstr(error, "out/test_weights: vertex 1 has no weight"));
    }
    (void)remove("out/test_weights");
}

/* A motion's frames from the angles that they are made of, but for where the root is. */
static void motion_by_its_angles(void) {
    static const char *name[4] = {"data/body/body.obj", "data/body/weights_cmu.txt",
                                  "data/motion/walk_02_01.skin", "data/body/skeleton_cmu.txt"};
    char               path[4][1024];
    figure             f;
    double             M[12 * 31], A[12 * 31], turn[3 * 31], worst = 0, out = 0;
    int                i, k, j;
    for (i = 0; i < 4; i++) strcpy(path[i], test_shared(name[i]));
    if (!*path[0] || !*path[1] || !*path[2] || !*path[3]) SKIP("no shared data");
    CHECK(figure_load(path[0], path[1], path[2], &f) == NULL);
    CHECK(figure_read_skeleton(path[3], &f) == NULL && f.lead == 60);
    figure_widen(&f);
    for (k = 0; k < 5; k++) {
        double shift[3];
        figure_walk(&f, 0.6 + 0.5 * k, M);
        for (j = 0; j < f.njoints; j++) figure_turn(M, f.parent[j], j, turn + 3 * j);
        figure_at(&f, turn, A);
        for (i = 0; i < 3; i++) shift[i] = M[4 * i + 3] - A[4 * i + 3];
        for (i = 0; i < 12 * f.njoints; i++)
            worst = fmax(worst, fabs(A[i] + (i % 4 == 3 ? shift[i % 12 / 4] : 0) - M[i]));
        figure_angles(&f, (uint64_t)k, 1, turn);
        for (i = 0; i < 3 * f.njoints; i++)
            out = fmax(out, fmax(f.range[i / 3][0][i % 3] - turn[i],
                                 turn[i] - f.range[i / 3][1][i % 3]));
    }
    printf("  31 joints, five frames: off by at most %.2g; angles at random out of range by %.2g\n",
           worst, out);
    CHECK(worst < 1e-5 && out < 1e-12);     /* the file's numbers are floats */
    figure_free(&f);
}

/* Joints hang together, a chain of two right angles is where it must be; what does not fit. */
static void joints_of_a_skeleton(void) {
    static const char *text[3] = {"# joints\n0 root -1 0 1 0 0 0 0\n1 arm 0 1 1 0 0 0 0\n"
                                  "2 hand 1 2 1 0 0 0 0\n", "0 root -1 0 1 0\n1 arm 1 1 1 0\n"
                                  "2 hand 1 2 1 0\n", "0 root -1 0 1 0\n1 arm 0 1 1 0\n"};
    const double       right = acos(0.0), turn[9] = {0, 0, 0, 0, 0, right, 0, right, 0};
    double             A[36], p[3] = {3, 1, 0}, x[3];
    int                k, r;
    if (!test_out()) SKIP("there is no directory out");
    for (k = 0; k < 3; k++) {
        figure      f;
        const char *error;
        FILE       *out = fopen("out/test_skeleton", "w");
        if (!out || fputs(text[k], out) < 0 || fclose(out)) exit(2);
        memset(&f, 0, sizeof f);
        f.njoints = 3;
        error = figure_read_skeleton("out/test_skeleton", &f);
        CHECK(k == 0 ? error == NULL : error && strstr(error, "does not fit"));
        for (r = 0; r < 3 && k == 0; r++) {
            if (r == 0) figure_at(&f, turn, A);
            x[r] = A[24 + 4 * r] * p[0] + A[24 + 4 * r + 1] * p[1] + A[24 + 4 * r + 2] * p[2]
                   + A[24 + 4 * r + 3];
        }
        figure_free(&f);
    }
    CHECK(fabs(x[0] - 1) < 1e-12 && fabs(x[1] - 2) < 1e-12 && fabs(x[2] + 1) < 1e-12);
    for (k = 0; k < 30; k++)                /* of ten motions one is tested, one watches */
        CHECK(data_split(chains_number(k)) == (k % 10 == 0 ? 2 : k % 10 == 1));
    (void)remove("out/test_skeleton");
}

/* --- a predictor and its file --- */

/* Sure of nothing, but every number of it is another. */
static void made_up(const wearer *w, int kind, predictor *p) {
    int i, k;
    CHECK(predictor_make(w, kind, 6, 5, p));
    for (k = 0; k < 2; k++)
        for (i = 0; i < p->swing.n[k ? NET_LAYERS : 0]; i++)
            p->mean[k][i] = uniform(-0.01, 0.01), p->over[k][i] = uniform(0.005, 0.02);
}

static void wear_shirt(wearer *w) {
    const char *error = wearer_make(&body, shirt.nv, shirt.x, shirt.nf, shirt.faces, w);
    if (error) printf("%s\n", error);
    CHECK(error == NULL);
    if (error) exit(2);
}

/* Written, read and written again: the same bytes, and of the three kinds the same garment. */
static void predictor_comes_back(void) {
    static unsigned char was[1 << 20], is[1 << 20];
    static wearer        w;
    double              *x = vectors(2 * shirt.nv), *y = x + 3 * shirt.nv;
    double               before[12 * SHAPES_BONES];
    int                  k;
    if (!test_out()) SKIP("there is no directory out");
    wear_shirt(&w);
    arms_in(0.49, before), arms_in(0.5, T);
    for (k = 0; k < PREDICT_KINDS; k++) {
        predictor p, q;
        size_t    n;
        made_up(&w, k, &p);
        CHECK(predictor_write("out/test_predictor", &p) == NULL);
        n = file_bytes("out/test_predictor", was, sizeof was);
        CHECK(n > 8 * (p.still.at[NET_LAYERS] + p.swing.at[NET_LAYERS])
              && n < sizeof was);
        CHECK(predictor_read("out/test_predictor", &q) == NULL && q.said[0] == 0);
        CHECK(q.kind == k && predictor_fits(&q, &w) == NULL);
        CHECK(predict(&w, &p, T, before, x) == NULL && predict(&w, &q, T, before, y) == NULL);
        CHECK(memcmp(x, y, 3 * (size_t)shirt.nv * sizeof *x) == 0);
        CHECK(fabs(x[0] - shirt.x[0]) > 1e-6 && fabs(x[0]) < 2);
        CHECK(predictor_write("out/test_predictor", &q) == NULL);
        CHECK(file_bytes("out/test_predictor", is, sizeof is) == n && memcmp(was, is, n) == 0);
        predictor_free(&p), predictor_free(&q);
    }
    (void)remove("out/test_predictor");
    wearer_free(&w), free(x);
}

/* What the second network says counts where joints move, and not at all where they are still; g is
 * s/(1 + s) of the rates alone. */
static void held_still_nothing_swings(void) {
    static wearer w;
    predictor     p;
    double       *x = vectors(3 * shirt.nv), *y = x + 3 * shirt.nv, *z = y + 3 * shirt.nv;
    double        before[12 * SHAPES_BONES], in[6 * SHAPES_BONES], was[6 * SHAPES_BONES], s = 0;
    int           i;
    wear_shirt(&w);
    arms_in(0.48, before), arms_in(0.5, T);
    made_up(&w, PREDICT_FRAMES, &p);
    for (i = 3 * SHAPES_BONES; i < 6 * SHAPES_BONES; i++) p.mean[0][i] = 0;
    predict_inputs(T, before, SHAPES_BONES, in);
    for (i = 3 * SHAPES_BONES; i < 6 * SHAPES_BONES; i++) s += pow(in[i] / p.over[0][i], 2);
    memcpy(was, in, sizeof was);
    CHECK_NEAR(predictor_scale(&p, in), s / (1 + s), 1e-14);
    CHECK_NEAR(in[7], (was[7] - p.mean[0][7]) / p.over[0][7], 1e-14);
    CHECK(predict(&w, &p, T, T, x) == NULL && predict(&w, &p, T, before, z) == NULL);
    CHECK(learn_distance(shirt.nv, x, z) > 1e-5);
    memset(p.swing.p, 0, p.swing.at[NET_LAYERS] * sizeof(double));
    CHECK(predict(&w, &p, T, T, y) == NULL && predict(&w, &p, T, before, z) == NULL);
    CHECK(learn_distance(shirt.nv, x, y) == 0 && learn_distance(shirt.nv, x, z) == 0);
    predictor_free(&p), wearer_free(&w), free(x);
}

static int reads(const unsigned char *bytes, size_t n, const char *word, const char *value) {
    predictor   p;
    const char *error;
    FILE       *f = fopen("out/test_predictor", "wb");
    int         good;
    if (!f || fwrite(bytes, 1, n, f) != n) exit(2);
    fclose(f);
    error = predictor_read("out/test_predictor", &p);
    good = error && strstr(error, word) && strstr(error, value);
    if (!good && word[0]) printf("  '%s' lacks '%s' or '%s'\n", error ? error : "", word, value);
    predictor_free(&p);
    return good;
}

/* A field's number in place of its own: what is said has its name and that number. */
static void a_field(unsigned char *bytes, size_t n, int at, uint32_t value, const char *name) {
    uint32_t was;
    char     text[24];
    memcpy(&was, bytes + 8 + 4 * at, 4), memcpy(bytes + 8 + 4 * at, &value, 4);
    sprintf(text, ": %lu is not in", (unsigned long)value);
    CHECK(reads(bytes, n, name, at == 6 && value ? "bytes" : text));
    memcpy(bytes + 8 + 4 * at, &was, 4);
}

static void predictor_refuses(void) {
    static unsigned char is[1 << 20];
    static wearer        w;
    predictor            p;
    size_t               n, i, at;
    double               was, bad[3];
    if (!test_out()) SKIP("there is no directory out");
    wear_shirt(&w);
    made_up(&w, PREDICT_SPACE, &p);
    CHECK(predictor_write("out/test_predictor", &p) == NULL);
    n = file_bytes("out/test_predictor", is, sizeof is);
    for (i = 0; i < 8; i++) CHECK(reads(is, i, "begin with", "KDSMNET2"));
    for (; i < 52; i++) CHECK(reads(is, i, "head", "cut short"));
    for (; i < n; i += 1 + n / 97) CHECK(reads(is, i, "bytes, by its head", "the predictor's"));
    CHECK(reads(is, n - 1, "bytes", "head") && reads(is, n + 1, "bytes", "head"));
    a_field(is, n, 0, 3, "kind"), a_field(is, n, 1, 0, "joints");
    a_field(is, n, 1, 4000000000u, "joints"), a_field(is, n, 2, 0, "vertices of the garment");
    a_field(is, n, 3, 0, "vertices of the body"), a_field(is, n, 4, 0, "faces of the garment");
    a_field(is, n, 5, 7, "inputs"), a_field(is, n, 6, 0, "first layer");
    a_field(is, n, 7, 20000, "second layer"), a_field(is, n, 8, 1, "outputs");
    a_field(is, n, 6, 7, "bytes, by its head");
    at = 52 + (size_t)((unsigned char *)p.over[1] - (unsigned char *)p.u);
    bad[0] = 0, bad[1] = -1, bad[2] = HUGE_VAL;
    for (i = 0; i < 3; i++) {
        memcpy(&was, is + at + 16, sizeof was), memcpy(is + at + 16, bad + i, sizeof was);
        CHECK(reads(is, n, "deviation of outputs [2]", i == 0 ? " 0 " : i == 1 ? " -1 " : " inf "));
        memcpy(is + at + 16, &was, sizeof was);
    }
    for (i = 44; i < n; i += 1 + n / 97) {  /* a bit, in a number or in a hash */
        is[i] ^= 1;
        CHECK(reads(is, n, "the predictor's hash", "of what is in the file"));
        is[i] ^= 1;
    }
    predictor_free(&p);
    CHECK(strstr(predictor_read("out/there is none", &p), "opened") != NULL);
    (void)remove("out/test_predictor");
    predictor_free(&p), wearer_free(&w);
}

/* A joint and the root turned about an axis by an angle: the input is axis times angle. */
static void inputs_are_axis_times_angle(void) {
    double in[6 * SHAPES_BONES], still[12 * SHAPES_BONES], worst = 0;
    int    k, c, i;
    for (k = 0; k < 50; k++) {
        double       turn[2][3], R[2][9], shift[3] = {1, 2, 3};
        const double big = k < 5 ? 1e-7 : 3.1;
        for (i = 0; i < 2; i++) {
            double a[3], l;
            for (c = 0; c < 3; c++) a[c] = uniform(-1, 1);
            l = sqrt(kdsmi_dot(a, a));
            for (c = 0; c < 3; c++) a[c] /= l;
            l = uniform(0, big);
            for (c = 0; c < 3; c++) turn[i][c] = l * a[c];
            for (c = 0; c < 9; c++) {       /* Rodrigues */
                const int    r = c / 3, q = c % 3;
                const double sign = r == q ? 0 : (q - r + 3) % 3 == 1 ? -1 : 1;
                R[i][c] = (r == q) * cos(l) + (1 - cos(l)) * a[r] * a[q];
                R[i][c] += sin(l) * sign * a[(6 - r - q) % 3];
            }
        }
        identity(T);
        for (c = 0; c < 9; c++) {
            T[4 * (c / 3) + c % 3] = R[0][c], T[12 * 5 + 4 * (c / 3) + c % 3] = 0;
            for (i = 0; i < 3; i++)         /* R_0 R */
                T[12 * 5 + 4 * (c / 3) + c % 3] += R[0][3 * (c / 3) + i] * R[1][3 * i + c % 3];
        }
        for (c = 0; c < 3; c++) T[4 * c + 3] = shift[c];
        predict_inputs(T, T, SHAPES_BONES, in);
        for (c = 0; c < 3; c++) {
            worst = fmax(worst, fabs(in[c] - turn[0][c]));
            worst = fmax(worst, fabs(in[15 + c] - turn[1][c]));
        }
        for (c = 0; c < 3 * SHAPES_BONES; c++) worst = fmax(worst, fabs(in[3 * SHAPES_BONES + c]));
        identity(still);                    /* turned from rest in a step: six steps in 0.1 s */
        predict_inputs(T, still, SHAPES_BONES, in);
        for (c = 0; c < 3; c++)
            worst = fmax(worst, fabs(in[3 * SHAPES_BONES + c] / 6 - turn[0][c]));
    }
    printf("  off by at most %.2g\n", worst);
    CHECK(worst < 1e-8);
}

/* Joints, sizes, shapes: each is told from the wearer's. */
static void predictor_of_another(void) {
    static wearer w;
    predictor     p;
    const char   *error;
    int           way, i;
    wear_shirt(&w);
    made_up(&w, PREDICT_SPACE, &p);
    CHECK(predictor_fits(&p, &w) == NULL);
    p.njoints++;
    CHECK(strstr(predictor_fits(&p, &w), "joints: 14, here 13") != NULL);
    p.njoints--, p.nv--;
    CHECK(strstr(predictor_fits(&p, &w), "vertices of the garment") != NULL);
    p.nv++, p.u[5] += 1e-9;
    CHECK(strstr(predictor_fits(&p, &w), "others") != NULL);
    p.u[5] = w.cloth->u[5], p.id ^= 1;
    CHECK(strstr(predictor_fits(&p, &w), "others") != NULL);
    p.id ^= 1, wearer_free(&w);
    for (way = 0; way < 2; way++) {         /* left and right exchanged, and back */
        const int n = body.nv * body.influences;
        for (i = 0; i < n; i++)
            if (body.shape.bone[i] > 2 && body.shape.bone[i] < 11)
                body.shape.bone[i] = ((body.shape.bone[i] - 3) ^ 1) + 3;
        wear_shirt(&w);
        error = predictor_fits(&p, &w);
        CHECK(way ? error == NULL : error && strstr(error, "others"));
        wearer_free(&w);
    }
    predictor_free(&p);
}

/* A tube's volume, closed by its fans: that of the prism. */
static void volume_of_what_is_closed(void) {
    static lesson s;
    enum { n = 7 };
    const double  pi = acos(-1.0), shift[3] = {0.3, -2, 1};
    double        x[6 * n], area = 0.5 * n * sin(2 * pi / n) * 0.25, v;
    int           f[6 * n], i, c;
    for (i = 0; i < n; i++) {
        const int j = (i + 1) % n, two[6] = {i, j, n + j, i, n + j, n + i};
        memcpy(f + 6 * i, two, sizeof two);
        for (c = 0; c < 2; c++) {
            double *p = x + 3 * (c * n + i);
            p[0] = 0.5 * cos(2 * pi * i / n) + shift[0];
            p[1] = 0.5 * sin(2 * pi * i / n) + shift[1];
            p[2] = 3 * c + shift[2];
        }
    }
    memset(&s, 0, sizeof s);
    s.g.nf = 2 * n, s.g.faces = f;
    CHECK(learn_rims(&s));
    v = learn_volume(&s, x);
    printf("  %d edges, volume %.12f of %.12f\n", s.nrim, v, 3 * area);
    CHECK(s.nrim == 2 * n && fabs(v - 3 * area) < 1e-12);
    free(s.rim);
}

/* Poses, examples, a training, a file, a prediction: as 02_data.c and 03_learn.c do it. */
static void from_poses_to_a_predictor(void) {
    static lesson s;
    job           j;
    predictor     p, plain, q;
    marks         m, none;
    int           k;
    if (test_quick()) SKIP("a simulation: not in quick");
    if (!test_out()) SKIP("there is no directory out");
    j = chains_job("out/test_");
    j.edge = 0.05, j.poses = 1, j.steps = 4, j.chains = 7; /* none that watch */
    j.moves = 1, j.move = 15, j.every = 3, j.around = 0.05;
    chains_forget(&j);
    CHECK(chains_dress(&j) == NULL && chains_make(&j) == NULL && chains_merge(&j) == NULL);
    s.epochs = 300, s.hidden = 24, s.modes = 6;
    CHECK(data_read("out/test_data", &s.s) == NULL && figure_make(0.03, &s.f) == NULL);
    CHECK(garment_make(&s.f, 0.05, &s.g) == NULL && learn_prepare(&s) == NULL);
    CHECK(s.lost[PREDICT_FRAMES] < 1e-12 && s.lost[PREDICT_SPACE] < 1e-3);
    CHECK(learn_mean(&s, PREDICT_SPACE, 1, &plain) == NULL);
    CHECK(learn_train(&s, PREDICT_SPACE, 0, &p) == NULL);
    CHECK(predictor_write("out/test_data.net", &p) == NULL);
    CHECK(predictor_read("out/test_data.net", &q) == NULL && predictor_fits(&q, &s.w) == NULL);
    CHECK(learn_judge(&s, &q, 0, LEARN_ALL, &m) == NULL);
    CHECK(learn_judge(&s, &plain, 0, LEARN_ALL, &none) == NULL);
    CHECK(m.count[LEARN_STILL] == 7 && m.count[LEARN_MOVING] == 5 && m.count[LEARN_ALL] == 12);
    for (k = LEARN_STILL; k < LEARN_SORTS; k++) {
        printf("  %d %s examples learned from: %.2f mm, their mean %.2f; volume %.2f, %.2f %%\n",
               m.count[k], k == LEARN_STILL ? "settled" : "moving", 1e3 * m.error[k],
               1e3 * none.error[k], 100 * m.volume[k], 100 * none.volume[k]);
        CHECK(m.error[k] < 0.5 * none.error[k]);
    }
    predictor_free(&p), predictor_free(&q), predictor_free(&plain);
    chains_forget(&j), (void)remove("out/test_data"), (void)remove("out/test_data.net");
    learn_free(&s), chains_free(&j);
}

static void network_by_central_differences(void) {
    const int    n[NET_LAYERS + 1] = {5, 7, 6, 4};
    const double in[5] = {0.3, -0.7, 0.2, 0.9, -0.1}, want[4] = {0.5, -1, 0.25, 2}, h = 1e-6;
    double       worst = 0, big = 0;
    net          w;
    size_t       i;
    CHECK(net_make(n, 3, &w));
    for (i = 0; i < w.at[NET_LAYERS]; i++) w.p[i] += 0.01 * sin((double)i);
    (void)net_backward(&w, in, want, 0.7);
    for (i = 0; i < w.at[NET_LAYERS]; i++) {
        const double g = w.g[i], p = w.p[i];
        double       up, down;
        w.p[i] = p + h, up = net_backward(&w, in, want, 0.7);
        w.p[i] = p - h, down = net_backward(&w, in, want, 0.7);
        w.p[i] = p, w.g[i] = g;
        worst = fmax(worst, fabs((up - down) / (2 * h) - g)), big = fmax(big, fabs(g));
        memset(w.g, 0, w.at[NET_LAYERS] * sizeof(double));
        (void)net_backward(&w, in, want, 0.7);  /* the others were added to */
    }
    printf("  %d parameters, gradient up to %.3f, worst difference %.2g\n", (int)w.at[NET_LAYERS],
           big, worst);
    CHECK(worst < 1e-8 && big > 0.01);
    net_free(&w);
}

/* Rows of rank 3 and a little besides, by 3 modes: what they leave is the little; the modes are
 * perpendicular, and a network that says them, given to one that says all, says what they make. */
static void modes_are_of_most(void) {
    enum { n = 20, no = 30, k = 3 };
    double   full[n * no], mode[k * no], out[n * k], worst = 0, skew = 0, off = 0;
    net      to;
    training t;
    int      size[NET_LAYERS + 1] = {2, 5, 5, k}, e, i, m, q;
    memset(&t, 0, sizeof t);
    t.n = n, t.modes = k, t.mode = mode, t.out = out;
    for (e = 0; e < n; e++)
        for (i = 0; i < no; i++)
            full[e * no + i] = 3 * sin(e + 1.0) * cos(0.3 * i) + 2 * sin(2.0 * e) * (i % 3)
                               + cos(5.0 * e) * (i > 12) + 1e-6 * uniform(-1, 1);
    learn_modes(&t, full, no);
    for (e = 0; e < n; e++)
        for (i = 0; i < no; i++) {
            double sum = 0;
            for (m = 0; m < k; m++) sum += out[e * k + m] * mode[m * no + i];
            worst = fmax(worst, fabs(sum - full[e * no + i]));
        }
    for (m = 0; m < k; m++)
        for (q = 0; q < k; q++) {
            double sum = 0;
            for (i = 0; i < no; i++) sum += mode[m * no + i] * mode[q * no + i];
            skew = fmax(skew, fabs(sum - (m == q ? (double)no / k : 0)));
        }
    CHECK(net_make(size, 3, &t.w));
    size[3] = no;
    CHECK(net_make(size, 4, &to));
    training_give(&t, &to);
    for (e = 0; e < 5; e++) {
        const double  in[2] = {uniform(-1, 1), uniform(-1, 1)};
        const double *said = net_forward(&t.w, in), *all = net_forward(&to, in);
        for (i = 0; i < no; i++) {
            double sum = 0;
            for (m = 0; m < k; m++) sum += said[m] * mode[m * no + i];
            off = fmax(off, fabs(sum - all[i]));
        }
    }
    printf("  what 3 modes leave %.2g, off perpendicular %.2g, said %.2g\n", worst, skew, off);
    CHECK(worst < 1e-5 && worst > 1e-8 && skew < 1e-12 && off < 1e-12);
    net_free(&t.w), net_free(&to);
}

/* With the arms straight out at rest, the pose of the arms is no motion at all, their joints where
 * they were made turn back by as much, and both tell the same body but where weights mix. */
static void arms_out_at_rest(void) {
    figure      f;
    const char *error = figure_make(0.03, &f);
    double      turn[3 * SHAPES_BONES], M[12 * SHAPES_BONES], *x, worst = 0, apart = 0;
    double      lo = HUGE_VAL, hi = -HUGE_VAL, low = HUGE_VAL, high = -HUGE_VAL;
    int         i, arms = 0;
    if (error) exit(2);
    x = vectors(f.nv);
    figure_arms(&f, turn);
    CHECK(figure_arms_out(&f) == NULL && figure_arms_out(&f) != NULL);
    figure_at(&f, turn, M);
    for (i = 0; i < 12 * SHAPES_BONES; i++)
        worst = fmax(worst, fabs(M[i] - (i % 12 == 0 || i % 12 == 5 || i % 12 == 10)));
    figure_walk(&f, 0, M);
    figure_skin(&f, M, x);
    for (i = 0; i < f.nv; i++) {            /* forearms: all of one joint but for a thousandth */
        const int joint = f.joint[f.influences * i];
        if (f.weight[f.influences * i] < 0.999) continue;
        apart = fmax(apart, sqrt(kdsmi_distance2(x + 3 * i, body.x + 3 * i)));
        if (joint != 5 && joint != 6) continue;
        arms++, lo = fmin(lo, f.x[3 * i + 1]), hi = fmax(hi, f.x[3 * i + 1]);
        low = fmin(low, body.x[3 * i + 1]), high = fmax(high, body.x[3 * i + 1]);
    }
    printf("  arms out: off by %.2g; back: by %.2g m; %d vertices of forearms over %.2f m, %.2f as "
           "made\n", worst, apart, arms, hi - lo, high - low);
    CHECK(worst < 1e-14 && apart < 1e-3 && arms > 20);
    CHECK(hi - lo < 0.5 * (high - low));    /* level: as high as an arm is thick */
    free(x), figure_free(&f);
}

static void network_learns(void) {
    const int n[NET_LAYERS + 1] = {2, 24, 24, 2};
    double    first = 0, last = 0;
    net       w;
    int       e, i;
    CHECK(net_make(n, 1, &w));
    for (e = 0; e < 400; e++)
        for (last = 0, i = 0; i < 64; i++) {
            const double in[2] = {(i % 8) / 4.0 - 1, (i / 8) / 4.0 - 1};
            const double want[2] = {in[0] * in[1], sin(3 * in[0])};
            last += net_backward(&w, in, want, 1) / 64;
            if (i % 8 == 7) net_adam(&w, 3e-3, 0, 8);
            if (i == 63 && e == 0) first = last;
        }
    printf("  loss %.3g, at last %.3g\n", first, last);
    CHECK(last < 0.03 * first);
    net_free(&w);
}

static void scene_open(void) {
    const char *error = figure_make(0.03, &body);
    if (!error) error = shapes_shirt_make(0.03, &shirt);
    if (error) printf("%s\n", error), exit(1);
    basic = desc_of(&body);
    basic.coarse = 0.09, basic.near = 0.02;
    space = make(&basic);
    CHECK(kdsm_pose_create(space, &posed) == CLOTH_OK);
    CHECK(kdsm_cloth_create(space, shirt.nv, shirt.x, shirt.nf, shirt.faces, &cloth) == CLOTH_OK);
    if (!posed || !cloth) exit(1);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    scene_open();
    RUN(mesh_hangs_together);
    RUN(mesh_of_random_cuts_hangs_together);
    RUN(mesh_covers_the_thickened_body);
    RUN(weights_are_a_partition);
    RUN(skinning_moves_what_is_asked);
    RUN(embedding_gives_points_back);
    RUN(derivative_by_central_differences);
    RUN(barycentric_in_long_double);
    RUN(locate_is_brute_force);
    RUN(round_trip_is_exact_where_held);
    RUN(surface_of_the_body_is_at_rest);
    RUN(surface_keeps_the_offset);
    RUN(hybrid_takes_what_it_says);
    RUN(hybrid_morph_is_harmonic);
    RUN(orders_of_the_paper);
    RUN(placing_in_place_and_outside);
    RUN(scanned_body_and_shirt);
    RUN(shards_merge_to_the_same_bytes);
    RUN(merge_keeps_what_is_there);
    RUN(data_of_more_than_its_head_says);
    RUN(motions_have_the_same_joints);
    RUN(joints_of_a_skeleton);
    RUN(weights_of_every_vertex);
    RUN(motion_by_its_angles);
    RUN(network_by_central_differences);
    RUN(network_learns);
    RUN(modes_are_of_most);
    RUN(arms_out_at_rest);
    RUN(inputs_are_axis_times_angle);
    RUN(predictor_comes_back);
    RUN(held_still_nothing_swings);
    RUN(predictor_refuses);
    RUN(predictor_of_another);
    RUN(from_poses_to_a_predictor);
    RUN(volume_of_what_is_closed);
    RUN(refusals_of_the_desc);
    RUN(refusals_of_the_calls);
    RUN(refusals_of_what_is_far);
    RUN(memory_fails_and_nothing_leaks);
    kdsm_cloth_destroy(cloth);
    kdsm_pose_destroy(posed);
    kdsm_destroy(space);
    shapes_shirt_free(&shirt);
    figure_free(&body);
    test_failed += told.live != 0;
    if (told.live != 0) printf("%d blocks are not given back\n", told.live);
    return TEST_END();
}
