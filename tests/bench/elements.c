/* elements.c - nanoseconds per element of the kernels on an N x N sheet; median of repeated runs.
 *   cc -std=c99 -O3 -march=x86-64-v3 -ffp-contract=off bench/elements.c -lm && ./a.out 64
 * 'forces': gather positions, evaluate with the energy, store; 'with sums' adds the sum per
 * vertex. */
#define _POSIX_C_SOURCE 199309L
#define CLOTHSIM_IMPLEMENTATION
#include "../../clothsim.h"
#include "../test.h"

enum { LANES = CLOTHI_LANES, REPEATS = 31 };

typedef struct sheet {
    int     nv, nt, nh, bt, bh;             /* vertices, triangles, hinges and batches of them */
    int    *ti, *hi, *start, *entry;
    double *x, *tr, *hr, *qr, *f, *H, *out;
} sheet;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

static void *get(size_t count, size_t size) {
    void *p = clothi_alloc(NULL, count, size);
    if (!p) exit(1);
    return p;
}

/* Corner c of element e in the batched index list. */
static int *slot(int *index, int corners, int e, int c) {
    return index + (size_t)(e / LANES * corners + c) * LANES + e % LANES;
}

static void add_hinge(sheet *s, int n, int a, int b, int c, int d) {
    const int v[4] = {a, b, c, d};
    int       i, r;
    double    x[12], w[4];
    for (i = 0; i < 4; i++) {
        *slot(s->hi, 4, s->nh, i) = v[i];
        for (r = 0; r < 2; r++) x[3 * i + r] = (double)(r ? v[i] / n : v[i] % n) / (n - 1);
        x[3 * i + 2] = 0;
    }
    cloth_bend_quadratic_weights(x, w);
    s->hr[s->nh / LANES * 2 * LANES + s->nh % LANES] = 1e-5;
    s->qr[s->nh / LANES * 5 * LANES + s->nh % LANES] = 1e-5;
    for (i = 0; i < 4; i++) s->qr[(s->nh / LANES * 5 + 1 + i) * LANES + s->nh % LANES] = w[i];
    s->nh++;
}

static void add_triangle(sheet *s, int n, int a, int b, int c) {
    const int v[3] = {a, b, c};
    int       i, r;
    double    X[6], B[7];
    for (i = 0; i < 3; i++) {
        *slot(s->ti, 3, s->nt, i) = v[i];
        for (r = 0; r < 2; r++) X[2 * i + r] = (double)(r ? v[i] / n : v[i] % n) / (n - 1);
    }
    B[4] = clothi_rest_inverse(X, B);
    B[5] = 400;
    B[6] = 300;
    for (i = 0; i < 7; i++) s->tr[(s->nt / LANES * 7 + i) * LANES + s->nt % LANES] = B[i];
    s->nt++;
}

static void build(sheet *s, int n) {
    int    i, j, e, c, total = 0;
    size_t most_t = (size_t)(2 * n * n + LANES), most_h = (size_t)(3 * n * n + LANES);
    memset(s, 0, sizeof *s);
    s->nv = n * n;
    s->ti = (int *)get(3 * most_t, sizeof(int));
    s->hi = (int *)get(4 * most_h, sizeof(int));
    s->tr = (double *)get(7 * most_t, sizeof(double));
    s->hr = (double *)get(2 * most_h, sizeof(double));
    s->qr = (double *)get(5 * most_h, sizeof(double));
    s->f = (double *)get(9 * most_t + 12 * most_h, sizeof(double));
    s->x = (double *)get(3 * (size_t)s->nv, sizeof(double));
    s->out = (double *)get(3 * (size_t)s->nv, sizeof(double));
    s->H = (double *)get(90 * LANES, sizeof(double));
    s->start = (int *)get((size_t)s->nv + 1, sizeof(int));
    s->entry = (int *)get(3 * most_t + 4 * most_h, sizeof(int));
    for (j = 0; j + 1 < n; j++)
        for (i = 0; i + 1 < n; i++) {       /* one diagonal from a to d */
            const int a = j * n + i, b = a + 1, c2 = a + n, d = c2 + 1;
            add_triangle(s, n, a, b, d);
            add_triangle(s, n, a, d, c2);
            add_hinge(s, n, a, d, c2, b);
            if (j) add_hinge(s, n, a, b, d, a - n);
            if (i) add_hinge(s, n, c2, a, d, a - 1);
        }
    s->bt = (s->nt + LANES - 1) / LANES;
    s->bh = (s->nh + LANES - 1) / LANES;
    for (i = 0; i < 3 * s->nv; i++)
        s->x[i] = (i % 3 == 0 ? (double)(i / 3 % n) : i % 3 == 1 ? (double)(i / 3 / n) : 0.0)
                      / (n - 1) + 0.1 / n * sin(i * 12.9898);
    for (e = 0; e < s->nt; e++)
        for (c = 0; c < 3; c++) s->start[*slot(s->ti, 3, e, c) + 1]++;
    for (e = 0; e < s->nh; e++)
        for (c = 0; c < 4; c++) s->start[*slot(s->hi, 4, e, c) + 1]++;
    for (i = 0; i < s->nv; i++) s->start[i + 1] += s->start[i];
    for (e = 0; e < s->nt; e++)
        for (c = 0; c < 3; c++)
            s->entry[s->start[*slot(s->ti, 3, e, c)]++] =
                (e / LANES * 9 + 3 * c) * LANES + e % LANES;
    total = s->bt * 9 * LANES;
    for (e = 0; e < s->nh; e++)
        for (c = 0; c < 4; c++)
            s->entry[s->start[*slot(s->hi, 4, e, c)]++] =
                total + (e / LANES * 12 + 3 * c) * LANES + e % LANES;
    for (i = s->nv; i > 0; i--) s->start[i] = s->start[i - 1];
    s->start[0] = 0;
}

static void triangles(sheet *s, int what) {
    double x[9 * LANES], E[LANES], Ed[LANES];
    int    b;
    for (b = 0; b < s->bt; b++) {
        const double *rest = s->tr + b * 7 * LANES;
        double       *f = s->f + b * 9 * LANES;
        clothi_gather_lanes(s->x, s->ti + b * 3 * LANES, 3, x);
        switch (what) {
        case 0: clothi_stretch_lanes(x, rest, clothi_none, clothi_none, E, Ed, f); break;
        case 1: clothi_stretch_blocks(x, x, rest, clothi_none, clothi_none, 0, s->H); break;
        case 2: clothi_stretch_blocks(x, x, rest, clothi_none, clothi_none, 1, s->H); break;
        default: break;
        }
    }
}

static void hinges(sheet *s, int what) {
    double x[12 * LANES], E[LANES], Ed[LANES];
    int    b;
    for (b = 0; b < s->bh; b++) {
        const double *rest = s->hr + b * 2 * LANES;
        double       *f = s->f + s->bt * 9 * LANES + b * 12 * LANES;
        clothi_gather_lanes(s->x, s->hi + b * 4 * LANES, 4, x);
        switch (what) {
        case 0: clothi_hinge_lanes(x, rest, clothi_none, clothi_none, E, Ed, f); break;
        case 1: clothi_hinge_blocks(x, x, rest, clothi_none, clothi_none, 0, s->H); break;
        case 2: clothi_hinge_blocks(x, x, rest, clothi_none, clothi_none, 1, s->H); break;
        case 3:
            clothi_quadratic_lanes(x, s->qr + b * 5 * LANES, clothi_none, clothi_none, E, Ed, f);
            break;
        default: break;
        }
    }
}

static int ascending(const void *a, const void *b) {
    const double d = *(const double *)a - *(const double *)b;
    return (d > 0) - (d < 0);
}

/* Median ns for one pass over the sheet. */
static double measure(sheet *s, int tri, int hinge, int sums) {
    double t[REPEATS];
    int    i, k;
    for (i = 0; i < REPEATS; i++) {
        const double t0 = now();
        for (k = 0; k < 20; k++) {
            if (tri >= 0) triangles(s, tri);
            if (hinge >= 0) hinges(s, hinge);
            if (sums)
                clothi_sum_corners(s->f, s->start, s->start + 1, s->entry, 0, s->nv, -1.0,
                                   s->out);
        }
        t[i] = (now() - t0) / 20;
    }
    qsort(t, REPEATS, sizeof *t, ascending);
    return t[REPEATS / 2];
}

static int side = 64;

static void table(void) {
    static const char *name[4] = {"forces", "exact Hessian", "psd Hessian", "quadratic"};
    const int          n = side;
    sheet              s;
    double             both, quadratic;
    int                i;
    build(&s, n);
    printf("%d x %d sheet, %d triangles, %d hinges; ns per element\n", n, n, s.nt, s.nh);
    for (i = 0; i < 4; i++) {
        if (i < 3) printf("  %-14s triangle %6.2f", name[i], measure(&s, i, -1, 0) / s.nt);
        else printf("  %-14s                ", name[i]);
        printf("  hinge %6.2f\n", measure(&s, -1, i, 0) / s.nh);
    }
    both = measure(&s, 0, 0, 0) / (s.nt + s.nh);
    printf("  gather only    triangle %6.2f  hinge %6.2f\n", measure(&s, 9, -1, 0) / s.nt,
           measure(&s, -1, 9, 0) / s.nh);
    printf("  all elements   forces %6.2f, with sums %6.2f\n", both,
           measure(&s, 0, 0, 1) / (s.nt + s.nh));
    quadratic = measure(&s, 0, 3, 0) / (s.nt + s.nh);
    printf("  quadratic      forces %6.2f, with sums %6.2f\n", quadratic,
           measure(&s, 0, 3, 1) / (s.nt + s.nh));
}

int main(int argc, char **argv) {
    if (argc > 1) side = atoi(argv[1]);
    TEST_BEGIN(1, argv);
    RUN(table);
    return TEST_END();
}
