/* test_cholesky.c - the multifrontal factor against dense elimination and known eigenvalues.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_cholesky.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include "test.h"

static uint64_t seed = 1;

static double rnd(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) / 4503599627370496.0 - 1.0;
}

static const double pi = 3.14159265358979323846;

/* Edges of a w x h grid of springs that pull alike in all directions (the 5-point Laplacian). */
static int grid_edges(int w, int h, int **start, int **vertex) {
    int n = 0, i, j;
    *start = (int *)calloc((size_t)(2 * w * h + 1), sizeof(int));
    *vertex = (int *)calloc((size_t)(4 * w * h + 4), sizeof(int));
    (*start)[0] = 0;
    for (j = 0; j < h; j++)
        for (i = 0; i < w; i++) {
            int k;
            for (k = 0; k < 2; k++) {
                if (k ? j + 1 == h : i + 1 == w) continue;
                (*vertex)[2 * n] = j * w + i;
                (*vertex)[2 * n + 1] = j * w + i + (k ? w : 1);
                n++;
                (*start)[n] = 2 * n;
            }
        }
    return n;
}

static void spring_block(double k, double *block) {
    int i, j;
    for (i = 0; i < 6; i++)
        for (j = 0; j < 6; j++) block[6 * i + j] = i == j ? k : i % 3 == j % 3 ? -k : 0;
}

static cloth_matrix *grid_matrix(const cloth_hooks *hooks, int w, int h, cloth_pattern **P) {
    int *start, *vertex, n = grid_edges(w, h, &start, &vertex), e;
    cloth_matrix *A = NULL;
    double block[36];
    CHECK(cloth_pattern_create(hooks, w * h, n, start, vertex, NULL, P) == CLOTH_OK);
    if (*P) CHECK(cloth_matrix_create(hooks, *P, &A) == CLOTH_OK);
    spring_block(1.0, block);
    for (e = 0; A && e < n; e++) cloth_matrix_add_element(A, 2, vertex + 2 * e, block);
    free(start);
    free(vertex);
    return A;
}

/* eigenvalues of the free grid, each three times: 4 - 2 cos(pi a/w) - 2 cos(pi b/h) */
static double grid_eigenvalue(int w, int h, int a, int b) {
    return 4 - 2 * cos(pi * a / w) - 2 * cos(pi * b / h);
}

/* The eigenvectors are known too: A v = lambda v, so (A + s)^-1 v = v / (lambda + s). */
static void eigenvectors_of_a_grid(void) {
    int w = 40, h = 33, k, i;
    cloth_pattern *P = NULL;
    cloth_matrix  *A = grid_matrix(NULL, w, h, &P);
    cloth_factor  *f = NULL;
    double *b = (double *)malloc(sizeof(double) * 3 * (size_t)(w * h));
    CHECK(cloth_factor_create(NULL, P, &f) == CLOTH_OK);
    CHECK(cloth_factor_compute(f, A, NULL, 1e-3, NULL) == CLOTH_OK);
    for (k = 0; k < 8; k++) {
        int    a = k * 5 % w, c = k * 4 % h;
        double lambda = grid_eigenvalue(w, h, a, c), worst = 0;
        for (i = 0; i < 3 * w * h; i++)
            b[i] = i % 3 != k % 3 ? 0 : cos(pi * a * (i / 3 % w + 0.5) / w) *
                                            cos(pi * c * (i / 3 / w + 0.5) / h);
        CHECK(cloth_factor_solve(f, b, b) == CLOTH_OK);
        for (i = 0; i < 3 * w * h; i++) {
            double e = i % 3 != k % 3 ? 0 : cos(pi * a * (i / 3 % w + 0.5) / w) *
                                                cos(pi * c * (i / 3 / w + 0.5) / h);
            worst = fmax(worst, fabs(b[i] * (lambda + 1e-3) - e));
        }
        CHECK(worst < 1e-10);
    }
    free(b);
    cloth_factor_destroy(f);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(P);
}

/* Shifts between eigenvalues: the count of negative pivots is the count of eigenvalues below. */
static void inertia_of_a_grid(void) {
    int w = 23, h = 17, k, a, b, N = 3 * w * h;
    cloth_pattern *P = NULL;
    cloth_matrix  *A = grid_matrix(NULL, w, h, &P);
    cloth_factor  *f = NULL;
    double *d = (double *)malloc(sizeof(double) * 2 * (size_t)N), *Ad = d + N;
    CHECK(cloth_factor_create(NULL, P, &f) == CLOTH_OK);
    for (k = 0; k < 12; k++) {
        double shift = k == 0 ? 1e-3 : -0.0137 - 0.71 * k, dAd = 0, dd = 0, curvature;
        int    below = 0, i;
        cloth_factor_report rep;
        cloth_status status;
        for (a = 0; a < w; a++)
            for (b = 0; b < h; b++) below += 3 * (grid_eigenvalue(w, h, a, b) + shift < 0);
        status = cloth_factor_compute(f, A, NULL, shift, &rep);
        CHECK(status == (below ? CLOTH_ERR_NUMERIC : CLOTH_OK));
        CHECK(rep.negative == below && rep.zero == 0);
        CHECK((rep.bad_vertex >= 0) == (below > 0));
        curvature = cloth_factor_direction(f, d);
        CHECK((curvature < 0) == (below > 0));
        cloth_matrix_mul(A, NULL, d, Ad);
        for (i = 0; i < N; i++) {
            dAd += d[i] * (Ad[i] + shift * d[i]);
            dd += d[i] * d[i];
        }
        if (below) CHECK_REL(dAd, curvature, 1e-6);
        if (below) CHECK_NEAR(dd, 1, 1e-12);
        for (i = 0; i < N; i++) d[i] = rnd();           /* an indefinite factor solves as well */
        cloth_matrix_mul(A, NULL, d, Ad);
        for (i = 0; i < N; i++) Ad[i] += shift * d[i];
        CHECK(cloth_factor_solve(f, Ad, Ad) == CLOTH_OK);
        for (dd = 0, i = 0; i < N; i++) dd = fmax(dd, fabs(Ad[i] - d[i]));
        CHECK(dd < 1e-6);
    }
    free(d);
    cloth_factor_destroy(f);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(P);
}

/* The free grid itself: three zero eigenvalues, one an axis. Pinning one vertex cures it. */
static void singular_is_said(void) {
    int w = 12, h = 9, i, N = 3 * w * h;
    cloth_pattern *P = NULL;
    cloth_matrix  *A = grid_matrix(NULL, w, h, &P);
    cloth_factor  *f = NULL;
    cloth_factor_report rep;
    unsigned char *fixed = (unsigned char *)calloc((size_t)(w * h), 1);
    double *x = (double *)calloc(2 * (size_t)N, sizeof(double)), *b = x + N;
    CHECK(cloth_factor_create(NULL, P, &f) == CLOTH_OK);
    CHECK(cloth_factor_solve(f, x, x) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_factor_compute(f, A, NULL, 0, &rep) == CLOTH_ERR_NUMERIC);
    CHECK(rep.negative + rep.zero == 3);
    CHECK(fabs(cloth_factor_direction(f, x)) < 1e-12);
    CHECK(clothi_find_nonfinite(x, (size_t)N) < 0);
    fixed[w] = 7;
    CHECK(cloth_factor_compute(f, A, fixed, 0, &rep) == CLOTH_OK);
    for (i = 0; i < N; i++) x[i] = i / 3 == w ? 0 : rnd();
    cloth_matrix_mul(A, NULL, x, b);
    CHECK(cloth_factor_solve(f, b, b) == CLOTH_OK);
    for (i = 0; i < N; i++) CHECK_NEAR(b[i], x[i], 1e-10);
    for (i = 0; i < 9; i++) A->diag[9 * 5 + i] = NAN;
    CHECK(cloth_factor_compute(f, A, fixed, 0, &rep) == CLOTH_ERR_NONFINITE);
    CHECK(cloth_factor_solve(f, b, b) == CLOTH_ERR_ARGUMENT);
    free(x);
    free(fixed);
    cloth_factor_destroy(f);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(P);
}

/* A full matrix (one stencil of all vertices): Hilbert's, condition 1e13, and random ones, against
 * dense Cholesky in long double. */
static void dense_matrices(void) {
    int sizes[4] = {1, 3, 20, 60}, t, hilbert, i, j, k;
    for (t = 0; t < 4; t++)
        for (hilbert = 0; hilbert < 2; hilbert++) {
            int nv = sizes[t], N = 3 * nv, start[2], vertex[60];
            cloth_pattern *P = NULL;
            cloth_matrix  *A = NULL;
            cloth_factor  *f = NULL;
            double *M = (double *)malloc(sizeof(double) * (size_t)(N * N + 3 * N));
            double *x = M + N * N, *b = x + N, *y = b + N, worst = 0;
            long double *C = (long double *)malloc(sizeof(long double) * (size_t)(N * N + N));
            long double *z = C + N * N;
            start[0] = 0;
            start[1] = nv;
            for (i = 0; i < nv; i++) vertex[i] = nv - 1 - i;
            CHECK(cloth_pattern_create(NULL, nv, 1, start, vertex, NULL, &P) == CLOTH_OK);
            CHECK(cloth_matrix_create(NULL, P, &A) == CLOTH_OK);
            CHECK(cloth_factor_create(NULL, P, &f) == CLOTH_OK);
            for (i = 0; i < N; i++)
                for (j = 0; j < N; j++)
                    M[i * N + j] = hilbert && nv < 4 ? 1.0 / (i + j + 1) : i < j ? rnd() : 0;
            for (i = 0; i < N && !(hilbert && nv < 4); i++) {
                for (j = 0; j < i; j++) M[i * N + j] = M[j * N + i];
                M[i * N + i] = hilbert ? N : 0.8 * N + rnd();
            }
            CHECK(cloth_matrix_add_element(A, nv, vertex, M) == CLOTH_OK);
            CHECK(cloth_factor_compute(f, A, NULL, 0, NULL) == CLOTH_OK);
            for (i = 0; i < N; i++) b[i] = rnd();
            CHECK(cloth_factor_solve(f, b, x) == CLOTH_OK);
            for (j = 0; j < N; j++)                     /* element order: vertex[a] */
                for (i = j; i < N; i++) {
                    long double s = (long double)M[i * N + j];
                    for (k = 0; k < j; k++) s -= C[i * N + k] * C[j * N + k];
                    C[i * N + j] = i == j ? sqrtl(s) : s / C[j * N + j];
                }
            for (i = 0; i < N; i++) {
                z[i] = (long double)b[3 * vertex[i / 3] + i % 3];
                for (k = 0; k < i; k++) z[i] -= C[i * N + k] * z[k];
                z[i] /= C[i * N + i];
            }
            for (i = N - 1; i >= 0; i--) {
                for (k = i + 1; k < N; k++) z[i] -= C[k * N + i] * z[k];
                z[i] /= C[i * N + i];
                y[3 * vertex[i / 3] + i % 3] = (double)z[i];
            }
            for (k = 0; k < N; k++) worst = fmax(worst, fabs(y[k]));
            for (k = 0; k < N; k++)
                CHECK_NEAR(x[k], y[k], (hilbert && nv < 4 ? 1e-2 : 1e-12) * worst);
            cloth_matrix_mul(A, NULL, x, y);                  /* backward stable even so */
            for (k = 0; k < N; k++)
                CHECK_NEAR(y[k], b[k], 1e-14 * worst * (hilbert && nv < 4 ? 1.0 : N));
            cloth_factor_destroy(f);
            cloth_matrix_destroy(A);
            cloth_pattern_destroy(P);
            free(M);
            free(C);
        }
}

/* fixed unknowns of single axes, and a factor with extras used as a preconditioner */
static void masks_and_extras(void) {
    int w = 30, h = 30, N = 3 * w * h, i, k;
    cloth_pattern *P = NULL;
    cloth_matrix  *A = grid_matrix(NULL, w, h, &P);
    cloth_factor  *f = NULL;
    cloth_linear_solver *s = NULL;
    cloth_linear_options opt = cloth_linear_options_default();
    cloth_linear_report  rep;
    unsigned char *fixed = (unsigned char *)calloc((size_t)(w * h), 1);
    double *x = (double *)malloc(sizeof(double) * 3 * (size_t)N), *b = x + N, *y = b + N;
    double  block[36];
    for (i = 0; i < w * h; i++) fixed[i] = (unsigned char)(i % 11 == 3 ? i % 8 : 0);
    CHECK(cloth_factor_create(NULL, P, &f) == CLOTH_OK);
    CHECK(cloth_linear_solver_create(NULL, P, &s) == CLOTH_OK);
    for (i = 0; i < N; i++) x[i] = fixed[i / 3] >> i % 3 & 1 ? 0 : rnd();
    CHECK(cloth_factor_compute(f, A, fixed, 0.5, NULL) == CLOTH_OK);
    cloth_matrix_mul(A, NULL, x, b);
    for (i = 0; i < N; i++) b[i] += 0.5 * x[i] + (fixed[i / 3] >> i % 3 & 1 ? 100 : 0);
    CHECK(cloth_factor_solve(f, b, y) == CLOTH_OK);
    for (i = 0; i < N; i++) CHECK_NEAR(y[i], x[i], 1e-12);
    spring_block(3.0, block);
    for (k = 0; k < 25; k++) {
        int v[2];
        v[0] = k * 31 % (w * h);
        v[1] = (k * 57 + 400) % (w * h);
        CHECK(cloth_matrix_add_element(A, 2, v, block) == CLOTH_OK);
    }
    CHECK(A->ne > 15);
    CHECK(cloth_factor_compute(f, A, fixed, 0, NULL) == CLOTH_OK);
    cloth_matrix_mul(A, NULL, x, b);
    opt.method = CLOTH_LINEAR_CHOLESKY;
    opt.fixed = fixed;
    opt.tolerance = 1e-12;
    CHECK(cloth_linear_solve(s, A, b, y, &opt, &rep) == CLOTH_OK);
    CHECK(rep.iterations < 60 && !rep.negative && rep.factorizations == 1);
    for (i = 0; i < N; i++) CHECK_NEAR(y[i], x[i], 1e-9);
    for (i = 0; i < 9; i++) block[i] = i % 4 ? 0 : -1e6;
    for (i = 0; i < w * h; i++) CHECK(cloth_matrix_add_element(A, 1, &i, block) == CLOTH_OK);
    CHECK(cloth_linear_solve(s, A, b, y, &opt, &rep) == CLOTH_OK);
    CHECK(rep.negative && !rep.hit);     /* b.P^-1 b < 0: x = 0 */
    for (i = 0; i < N; i++) CHECK(fabs(y[i]) <= 0);
    cloth_linear_solver_destroy(s);
    cloth_factor_destroy(f);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(P);
    free(fixed);
    free(x);
}

typedef struct meter {
    long   left, count, live;
    size_t bytes;
} meter;

static void *meter_alloc(size_t size, void *user) {
    meter *m = (meter *)user;
    if (m->left == 0) return NULL;
    if (m->left > 0) m->left--;
    m->count++;
    m->live++;
    m->bytes += size;
    return malloc(size);
}

static void meter_free(void *ptr, size_t size, void *user) {
    meter *m = (meter *)user;
    m->live--;
    m->bytes -= size;
    free(ptr);
}

static void memory_is_counted(void) {
    meter       m;
    cloth_hooks hooks;
    cloth_pattern *P = NULL;
    cloth_matrix  *A;
    cloth_factor  *f = NULL;
    size_t before;
    long   n, run;
    memset(&m, 0, sizeof m);
    memset(&hooks, 0, sizeof hooks);
    m.left = -1;
    hooks.allocator.alloc = meter_alloc;
    hooks.allocator.free = meter_free;
    hooks.allocator.user = &m;
    A = grid_matrix(&hooks, 30, 40, &P);
    CHECK(cloth_pattern_bytes(P) + cloth_matrix_bytes(A) == m.bytes);
    for (n = 0;; n++) {                                 /* every allocation fails once */
        before = m.bytes;
        m.left = n;
        if (cloth_factor_create(&hooks, P, &f) == CLOTH_OK) {
            cloth_status status = cloth_factor_compute(f, A, NULL, 1, NULL);
            if (status == CLOTH_OK) break;
            CHECK(status == CLOTH_ERR_MEMORY);
        }
        cloth_factor_destroy(f);
        f = NULL;
        CHECK(m.bytes == before);
    }
    CHECK(n == 6);
    m.left = -1;
    CHECK(cloth_factor_bytes(f) + cloth_pattern_bytes(P) + cloth_matrix_bytes(A) == m.bytes);
    n = m.count;
    for (run = 0; run < 3; run++) CHECK(cloth_factor_compute(f, A, NULL, 2, NULL) == CLOTH_OK);
    CHECK(m.count == n);
    cloth_factor_destroy(f);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(P);
    CHECK(m.live == 0 && m.bytes == 0);
    cloth_factor_destroy(NULL);
}

/* Nested dissection of an n x n grid: the factor has O(n^2 log n) entries, O(n^3) flops [GL81]. */
static void fill_grows_as_it_should(void) {
    double entries[3], flops[3];
    int    k;
    for (k = 0; k < 3; k++) {
        cloth_pattern *P = NULL;
        cloth_matrix  *A = grid_matrix(NULL, 25 << k, 25 << k, &P);
        cloth_factor  *f = NULL;
        cloth_factor_report rep;
        CHECK(cloth_factor_create(NULL, P, &f) == CLOTH_OK);
        CHECK(cloth_factor_compute(f, A, NULL, 1, &rep) == CLOTH_OK);
        entries[k] = rep.entries;
        flops[k] = rep.flops;
        cloth_factor_destroy(f);
        cloth_matrix_destroy(A);
        cloth_pattern_destroy(P);
    }
    CHECK(entries[1] / entries[0] < 5.6 && entries[2] / entries[1] < 5.4);
    CHECK(flops[1] / flops[0] < 9.5 && flops[2] / flops[1] < 9.5);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(eigenvectors_of_a_grid);
    RUN(inertia_of_a_grid);
    RUN(singular_is_said);
    RUN(dense_matrices);
    RUN(masks_and_extras);
    RUN(memory_is_counted);
    RUN(fill_grows_as_it_should);
    return TEST_END();
}
