/* test_sparse.c - block matrices and linear solvers against dense algebra.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_sparse.c -lm -o test_sparse && ./test_sparse */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"

#include "test.h"
#include "host.h"
#include "reference.h"

/* --- a matrix built twice: through the kit, and dense by the test --- */

typedef struct problem {
    int                  n;                 /* vertices                                        */
    cloth_pattern       *pattern;
    cloth_matrix        *A;
    cloth_linear_solver *solver;
    double              *dense;             /* [3n x 3n], NULL for large ones                  */
    double              *b, *x, *y;         /* [3n]                                            */
    unsigned char       *fixed;
    unsigned long long   seed;
} problem;

static double uniform(problem *q) { return ref_uniform(&q->seed, -1, 1); }

static void *zeros(size_t count, size_t size) {
    void *p = calloc(count ? count : 1, size);
    if (!p) exit(1);
    return p;
}

/* Elements of a grid of w x h vertices with two triangles a cell, a stencil of four across each
 * diagonal; count in *nelem. */
static int *grid_elements(int w, int h, int *nelem, int **vertex) {
    int  i, j, e = 0, k = 0, cells = (w - 1) * (h - 1);
    int *start = (int *)zeros((size_t)(3 * cells + 1), sizeof(int));
    *vertex = (int *)zeros((size_t)(10 * cells + 1), sizeof(int));
    for (j = 0; j + 1 < h; j++)
        for (i = 0; i + 1 < w; i++) {
            const int a = j * w + i, c[10] = {a, a + 1, a + w, a + 1, a + w + 1, a + w,
                                              a + 1, a + w, a, a + w + 1};
            memcpy(*vertex + k, c, sizeof c);
            start[e++] = k;
            start[e++] = k + 3;
            start[e++] = k + 6;
            k += 10;
        }
    start[e] = k;
    *nelem = e;
    return start;
}

/* Adds H [3m x 3m] to both. */
static void add_both(problem *q, int m, const int *v, const double *H) {
    int a, b;
    CHECK(cloth_matrix_add_element(q->A, m, v, H) == CLOTH_OK);
    for (a = 0; q->dense && a < 3 * m; a++)
        for (b = 0; b < 3 * m; b++)
            q->dense[(size_t)(3 * v[a / 3] + a % 3) * (size_t)(3 * q->n) +
                     (size_t)(3 * v[b / 3] + b % 3)] += H[a * 3 * m + b];
}

/* A semidefinite element that does not feel translations: k sum of g g'. */
static void add_soft(problem *q, int m, const int *v, double k) {
    double H[144], g[12];
    int    r, a, b;
    memset(H, 0, sizeof H);
    for (r = 0; r < 3; r++) {
        for (a = 0; a < 3; a++) {
            double sum = 0;
            for (b = 1; b < m; b++) sum += g[3 * b + a] = uniform(q);
            g[a] = -sum;
        }
        for (a = 0; a < 3 * m; a++)
            for (b = 0; b < 3 * m; b++) H[a * 3 * m + b] += k * g[a] * g[b];
    }
    add_both(q, m, v, H);
}

static void add_mass(problem *q, double m) {
    double H[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    int    i;
    H[0] = H[4] = H[8] = m;
    for (i = 0; i < q->n; i++) add_both(q, 1, &i, H);
}

static void start_problem(problem *q, int n, int nelem, const int *start, const int *vertex,
                          const cloth_hooks *hooks, int dense) {
    const size_t n3 = 3 * (size_t)n;
    int          i;
    memset(q, 0, sizeof *q);
    q->n = n;
    q->seed = 7;
    CHECK(cloth_pattern_create(hooks, n, nelem, start, vertex, NULL, &q->pattern) == CLOTH_OK);
    CHECK(cloth_matrix_create(hooks, q->pattern, &q->A) == CLOTH_OK);
    CHECK(cloth_linear_solver_create(hooks, q->pattern, &q->solver) == CLOTH_OK);
    if (dense) q->dense = (double *)zeros(n3 * n3, sizeof(double));
    q->b = (double *)zeros(n3, sizeof(double));
    q->x = (double *)zeros(n3, sizeof(double));
    q->y = (double *)zeros(n3, sizeof(double));
    q->fixed = (unsigned char *)zeros((size_t)n, 1);
    for (i = 0; i < 3 * n; i++) q->b[i] = uniform(q);
}

/* A grid with mass m, stiffness about k. */
static void start_grid(problem *q, int w, int h, double m, double k, const cloth_hooks *hooks,
                       int dense) {
    int nelem, e, *vertex, *start = grid_elements(w, h, &nelem, &vertex);
    start_problem(q, w * h, nelem, start, vertex, hooks, dense);
    for (e = 0; e < nelem; e++)
        add_soft(q, start[e + 1] - start[e], vertex + start[e],
                 start[e + 1] - start[e] == 3 ? k : 0.01 * k);
    add_mass(q, m);
    free(start);
    free(vertex);
}

static void end_problem(problem *q) {
    cloth_linear_solver_destroy(q->solver);
    cloth_matrix_destroy(q->A);
    cloth_pattern_destroy(q->pattern);
    free(q->dense);
    free(q->b);
    free(q->x);
    free(q->y);
    free(q->fixed);
}

static int is_fixed(const problem *q, int i) { return q->fixed[i / 3] >> (i % 3) & 1; }

/* y = A x by the dense matrix, over the free axes. */
static void dense_mul(const problem *q, const double *x, double *y) {
    const int n = 3 * q->n;
    int       i, j;
    for (i = 0; i < n; i++) {
        y[i] = 0;
        for (j = 0; j < n && !is_fixed(q, i); j++)
            if (!is_fixed(q, j)) y[i] += q->dense[(size_t)i * (size_t)n + (size_t)j] * x[j];
    }
}

/* x of A x = b over the free axes by elimination with pivoting. */
static void dense_solve(const problem *q, double *x) {
    const size_t n = 3 * (size_t)q->n;
    double      *M = (double *)zeros(n * (n + 1), sizeof(double));
    size_t       i, j, k;
    for (i = 0; i < n; i++) {
        for (j = 0; j < n; j++)
            M[i * (n + 1) + j] = is_fixed(q, (int)i) || is_fixed(q, (int)j) ? i == j
                                                                            : q->dense[i * n + j];
        M[i * (n + 1) + n] = is_fixed(q, (int)i) ? 0 : q->b[i];
    }
    for (k = 0; k < n; k++) {
        size_t best = k;
        for (i = k; i < n; i++)
            if (fabs(M[i * (n + 1) + k]) > fabs(M[best * (n + 1) + k])) best = i;
        for (j = 0; j <= n; j++) {
            const double t = M[k * (n + 1) + j];
            M[k * (n + 1) + j] = M[best * (n + 1) + j];
            M[best * (n + 1) + j] = t;
        }
        for (i = k + 1; i < n; i++) {
            const double f = M[i * (n + 1) + k] / M[k * (n + 1) + k];
            for (j = k; j <= n && fabs(f) > 0; j++) M[i * (n + 1) + j] -= f * M[k * (n + 1) + j];
        }
    }
    for (k = n; k-- > 0;) {
        x[k] = M[k * (n + 1) + n];
        for (j = k + 1; j < n; j++) x[k] -= M[k * (n + 1) + j] * x[j];
        x[k] /= M[k * (n + 1) + k];
    }
    free(M);
}

static double largest(const double *a, int n) {
    double big = 0;
    int    i;
    for (i = 0; i < n; i++)
        if (!(fabs(a[i]) <= big)) big = fabs(a[i]);
    return big;
}

static double dot(const double *a, const double *b, int n) {
    double sum = 0;
    int    i;
    for (i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* b.x - x.A x / 2 and |b - A x| / |b| over the free axes, by the dense matrix. */
static double model(const problem *q, double *residual) {
    const int n = 3 * q->n;
    double    rr = 0, bb = 0;
    int       i;
    dense_mul(q, q->x, q->y);
    for (i = 0; i < n; i++)
        if (!is_fixed(q, i)) {
            rr += (q->b[i] - q->y[i]) * (q->b[i] - q->y[i]);
            bb += q->b[i] * q->b[i];
        }
    if (residual) *residual = bb > 0 ? sqrt(rr / bb) : 0;
    return dot(q->b, q->x, n) - 0.5 * dot(q->x, q->y, n);
}

static void add_far(problem *q, int count) {
    int e;
    for (e = 0; e < count; e++) {
        const int m = 2 + e % 3;
        int       v[4], k;
        for (k = 0; k < m; k++) {
            const double u = 0.5 + 0.5 * uniform(q);
            v[k] = (int)(u * q->n) % q->n;
        }
        if (m == 2 && v[0] == v[1]) v[1] = (v[0] + 1) % q->n;
        add_soft(q, m, v, 2);
    }
}

static void fix_some(problem *q, int how) {
    int i;
    for (i = 0; i < q->n; i++)
        q->fixed[i] = (unsigned char)(how == 0 ? 0 : how == 1 ? (i % 7 == 0 ? i / 7 % 8 : 0) : 7);
}

/* --- tests --- */

static void mul(void) {
    int size;
    for (size = 0; size < 2; size++) {
        problem q;
        int     i;
        start_grid(&q, size ? 25 : 6, size ? 22 : 5, 1, 10, NULL, 1);
        add_far(&q, 40);
        for (i = 0; i < 2; i++) {
            double *z = (double *)zeros(3 * (size_t)q.n, sizeof(double));
            fix_some(&q, i);
            for (i = 0; i < 3 * q.n; i++) q.x[i] = is_fixed(&q, i) ? 0 : uniform(&q);
            cloth_matrix_mul(q.A, q.fixed, q.x, z);
            dense_mul(&q, q.x, q.y);
            for (i = 0; i < 3 * q.n; i++) CHECK_NEAR(z[i], q.y[i], 1e-11);
            i = q.fixed[7];
            free(z);
        }
        end_problem(&q);
    }
}

static void order(void) {
    int nelem, *vertex, *start = grid_elements(64, 64, &nelem, &vertex), e, a, b, inside = 0;
    cloth_pattern *p;
    char          *seen = (char *)zeros(64 * 64, 1);
    CHECK(cloth_pattern_create(NULL, 64 * 64, nelem, start, vertex, NULL, &p) == CLOTH_OK);
    CHECK(p->nd == 4);
    for (a = 0; a < 64 * 64; a++) {
        inside += clothi_pattern_domain(p, a) >= 0;
        CHECK(!seen[p->row_of[a]] && p->vertex_of[p->row_of[a]] == a);
        seen[p->row_of[a]] = 1;
    }
    printf("  %.1f %% of 64 x 64 vertices are in leaves\n", 100.0 * inside / (64 * 64));
    CHECK(inside > 0.93 * 64 * 64);
    for (a = 0; a < 4; a++) CHECK(p->dom[a + 1] - p->dom[a] > 0.2 * 64 * 64);
    for (e = 0; e < nelem; e++)
        for (a = start[e]; a < start[e + 1]; a++)
            for (b = start[e]; b < a; b++) {
                const int s = clothi_pattern_slot(p, vertex[a], vertex[b]);
                const int t = clothi_pattern_slot(p, vertex[b], vertex[a]);
                const int da = clothi_pattern_domain(p, vertex[a]);
                const int db = clothi_pattern_domain(p, vertex[b]);
                CHECK(s >= 0 && s / 2 == t / 2 && s % 2 != t % 2);
                CHECK(da < 0 || db < 0 || da == db);
            }
    CHECK(clothi_pattern_slot(p, 0, 64 * 64 - 1) == -1);
    CHECK(cloth_pattern_bytes(p) > 0);
    cloth_pattern_destroy(p);
    free(seen);
    free(start);
    free(vertex);
}

static const cloth_linear    methods[4] = {CLOTH_LINEAR_JACOBI, CLOTH_LINEAR_SGS, CLOTH_LINEAR_SGS,
                                           CLOTH_LINEAR_AUTO};
static const int only[4] = {0, 1, 2, 0};       /* as chosen, floats, doubles, as chosen */

static cloth_linear_options way(int k, cloth_linear_solver *solver) {
    cloth_linear_options o = cloth_linear_options_default();
    o.method = methods[k];
    solver->only = only[k];
    return o;
}

/* A step that ended at the radius and says truly by how much it lowered the model. */
static void check_at_radius(problem *q, const cloth_linear_report *r, double size, double tol) {
    const double Q = model(q, NULL);
    CHECK_NEAR(largest(q->x, 3 * q->n), size, tol);
    CHECK(Q > 0);
    CHECK_NEAR(r->decrease, Q, 1e-3 * Q);
}

/* Whether a force without symmetry leads CG to a radius far out: by negative curvature alone. */
static int falls(problem *q, const unsigned char *fixed) {
    cloth_linear_options o = cloth_linear_options_default();
    cloth_linear_report  r;
    unsigned long long   seed = 7;
    int                  i;
    for (i = 0; i < 3 * q->n; i++) q->y[i] = ref_uniform(&seed, -1, 1);
    o.fixed = fixed, o.tolerance = 1e-10, o.radius = 1e9, o.method = CLOTH_LINEAR_SGS;
    CHECK(cloth_linear_solve(q->solver, q->A, q->y, q->x, &o, &r) == CLOTH_OK);
    o.method = CLOTH_LINEAR_JACOBI;
    if (r.negative && !r.hit)
        CHECK(cloth_linear_solve(q->solver, q->A, q->y, q->x, &o, &r) == CLOTH_OK);
    return r.hit;
}

/* A negative direction is found, and it is one. */
static void check_downhill(problem *q, const unsigned char *fixed) {
    CHECK(falls(q, fixed));
    dense_mul(q, q->x, q->y);
    CHECK(dot(q->x, q->y, 3 * q->n) < 0);
}

/* Every method, width and mask, with and without far pairs. */
static void solve_all(void) {
    const double tight[4] = {1e-12, 1e-6, 1e-12, 1e-5};
    const int    width[3] = {1, 6, 25}, height[3] = {1, 5, 21};
    int          size, far, how, k, i;
    for (size = 0; size < 3; size++)
        for (far = 0; far < 2; far++) {
            problem q;
            double *exact;
            start_grid(&q, width[size], height[size], 1, 30, NULL, 1);
            exact = (double *)zeros(3 * (size_t)q.n, sizeof(double));
            if (far && size) add_far(&q, 3 * q.n / 4);
            for (how = 0; how < 3; how++) {
                fix_some(&q, how);
                if (size < 2) dense_solve(&q, exact);
                for (k = 0; k < 4; k++) {
                    cloth_linear_options o = way(k, q.solver);
                    cloth_linear_report  r;
                    double               residual, Q, size_of = largest(exact, 3 * q.n);
                    o.fixed = q.fixed;
                    o.tolerance = tight[k];
                    CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
                    Q = model(&q, &residual);
                    CHECK(r.negative == 0 && r.hit == 0 && r.residual <= o.tolerance);
                    CHECK(residual <= 30 * o.tolerance);
                    CHECK_NEAR(r.decrease, Q, (k == 1 ? 1e-5 : 1e-7) * (1e-30 + Q));
                    if (how == 2) CHECK(r.iterations == 0);
                    for (i = 0; i < 3 * q.n; i++) {
                        if (is_fixed(&q, i)) CHECK(!(fabs(q.x[i]) > 0));
                        if (size < 2)
                            CHECK_NEAR(q.x[i], exact[i], 100 * o.tolerance * size_of + 1e-300);
                    }
                    o.tolerance = 0.1;      /* a loose one: the claim still holds */
                    CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
                    model(&q, &residual);
                    CHECK(r.residual <= 0.1 && residual <= 3);
                }
            }
            free(exact);
            end_problem(&q);
        }
}

/* |b - A x|/|b| by the kit's product, which mul tests; nothing is fixed. */
static double residual(problem *q) {
    double rr = 0, bb = 0;
    int    i;
    cloth_matrix_mul(q->A, NULL, q->x, q->y);
    for (i = 0; i < 3 * q->n; i++) {
        rr += (q->b[i] - q->y[i]) * (q->b[i] - q->y[i]);
        bb += q->b[i] * q->b[i];
    }
    return sqrt(rr / bb);
}

/* Asked for more than rounding leaves, each method ends near there, and soon. */
static void beyond_rounding(void) {
    int k, size;
    for (size = 6; size <= 40; size += 34)
        for (k = 0; k < 6; k++) {
            cloth_linear_options o = cloth_linear_options_default();
            cloth_linear_report  r;
            problem              q;
            start_grid(&q, size, size, 1e-3, 10, NULL, 0);
            o.method = k % 3 == 0 ? CLOTH_LINEAR_SGS : k % 3 == 1 ? CLOTH_LINEAR_JACOBI
                                                                  : CLOTH_LINEAR_CHOLESKY;
            o.tolerance = k < 3 ? 1e-30 : 0;
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
            if (!CHECK(residual(&q) < 1e-11 && r.iterations < 3000 && !r.negative))
                printf("  %d, method %d: %d iterations, residual %.1e\n", size, (int)o.method,
                       r.iterations, residual(&q));
            end_problem(&q);
        }
}

/* Sheets of few vertices, which the coarse space solves: the step after that is of rounding alone;
 * JACOBI would go on until squares underflow. With a radius, which the answer does not
 * reach, and without. */
static void beyond_coarse(void) {
    int e, k, size, bad = 0;
    for (e = 0; e < 36; e++)
        for (size = 2; size < 6; size++)
            for (k = 0; k < 8; k++) {
                cloth_linear_options o = cloth_linear_options_default();
                cloth_linear_report  r;
                problem              q;
                start_grid(&q, size, 2 + k / 2, pow(10, e % 6 - 3), pow(10, e / 6 - 2), NULL, 0);
                o.method = k & 4 ? CLOTH_LINEAR_JACOBI : CLOTH_LINEAR_SGS;
                o.tolerance = 0;
                o.radius = k & 1 ? 1e5 : 0;
                CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
                bad += !(r.residual < 1e-10 && residual(&q) < 1e-8) || r.negative || r.hit;
                end_problem(&q);
            }
    CHECK(bad == 0);
}

/* x in the array of b, of which fixed axes are not read: the same bits. */
static void in_place(void) {
    int k, i;
    for (k = 0; k < 4; k++) {
        const size_t         bytes = 3 * 72 * sizeof(double);
        problem              q;
        cloth_linear_options o;
        start_grid(&q, 8, 9, 1, 10, NULL, 0);
        o = way(k, q.solver);
        if (k == 3) o.method = CLOTH_LINEAR_CHOLESKY;
        fix_some(&q, 1);
        o.fixed = q.fixed;
        for (i = 0; i < 3 * q.n; i++)
            if (is_fixed(&q, i)) q.b[i] = (double)NAN;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_OK);
        memcpy(q.y, q.b, bytes);
        CHECK(cloth_linear_solve(q.solver, q.A, q.y, q.y, &o, NULL) == CLOTH_OK);
        CHECK(largest(q.x, 3 * q.n) > 0 && memcmp(q.x, q.y, bytes) == 0);
        end_problem(&q);
    }
}

/* Of b of any size x is as right: down to where the squares of doubles underflow. */
static void scales(void) {
    int    k, e, i;
    double s = 1;
    for (e = 0; e <= 140; e += 7, s *= 1e-7)
        for (k = 0; k < 4; k++) {
            problem              q;
            cloth_linear_options o;
            cloth_linear_report  r;
            if (only[k] == 1) continue;
            start_grid(&q, 8, 9, 1, 10, NULL, 0);
            o = way(k, q.solver), o.tolerance = 1e-3;
            for (i = 0; i < 3 * q.n; i++) q.b[i] *= s;
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
            CHECK(r.iterations > 0 && r.residual <= 1e-3);
            for (i = 0; i < 3 * q.n; i++) q.x[i] /= s, q.b[i] /= s;
            CHECK(residual(&q) < 1e-2);
            end_problem(&q);
        }
}

/* A stretched quadratic with negative directions; radius and no radius. */
static void indefinite(void) {
    int far, k, i;
    for (far = 0; far < 2; far++) {
        problem q;
        double  H[9] = {-3, 0, 0, 0, -3, 0, 0, 0, -3};
        start_grid(&q, 24, 23, 2, 10, NULL, 1);
        if (far) add_far(&q, 300);
        fix_some(&q, 1);
        for (i = 0; i < q.n; i++) add_both(&q, 1, &i, H);
        for (k = 0; k < 4; k++) {
            cloth_linear_options o = way(k, q.solver);
            cloth_linear_report  r;
            o.fixed = q.fixed;
            o.tolerance = 1e-6;
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
            CHECK(r.negative == 1 && r.hit == 0);
            CHECK(dot(q.b, q.x, 3 * q.n) >= 0);
            o.radius = 0.5;
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
            if (r.hit) {
                check_at_radius(&q, &r, 0.5, k == 1 || k == 3 ? 1e-5 : 1e-12);
            } else {                        /* the set-up gave up: only -3 on a free axis does */
                CHECK(r.negative == 1 && !(largest(q.x, 3 * q.n) > 0));
                CHECK(methods[k] != CLOTH_LINEAR_JACOBI);
            }
        }
        check_downhill(&q, q.fixed);
        end_problem(&q);
    }
}

/* Two vertices pull apart: negative along b, of which the coarse space sees nothing. Without a
 * radius x is what the preconditioner makes of b: downhill. */
static void negative_at_once(void) {
    static const int v[2] = {0, 1};
    double           H[36] = {0};
    problem          q;
    int              k, i;
    start_grid(&q, 24, 23, 2, 0.01, NULL, 1);
    for (i = 0; i < 36; i++) H[i] = i / 6 % 3 == i % 6 % 3 && i / 18 != i % 6 / 3 ? 5 : 0;
    add_both(&q, 2, v, H);
    for (i = 0; i < 3 * q.n; i++) q.b[i] = i < 3 ? 1 + i : i < 6 ? 2 - i : 0;
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = way(k, q.solver);
        cloth_linear_report  r;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        CHECK(r.negative == 1 && !r.hit && r.iterations == 0 && dot(q.b, q.x, 6) > 1);
        CHECK_NEAR(r.decrease, model(&q, NULL), 1e-6 * r.decrease);
    }
    end_problem(&q);
}

/* Diagonal blocks that are not positive: within a radius JACOBI goes on, the others say so. */
static void no_diagonal(void) {
    problem q;
    double  H[9] = {-200, 3, 0, 3, -100, 0, 0, 0, -1};
    int     k, i;
    start_grid(&q, 24, 23, 2, 10, NULL, 1);
    for (i = 0; i < q.n; i += 7) add_both(&q, 1, &i, H);
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = cloth_linear_options_default();
        cloth_linear_report  r;
        o.method = methods[k];
        q.solver->only = only[k];
        o.tolerance = 1e-6;
        o.radius = 0.25;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        CHECK(r.negative == 1 && r.hit == (o.method == CLOTH_LINEAR_JACOBI));
        if (r.hit) {
            const double Q = model(&q, NULL);
            CHECK_NEAR(largest(q.x, 3 * q.n), 0.25, 1e-12);
            CHECK(Q > 0 && dot(q.b, q.x, 3 * q.n) >= 0);
            CHECK_NEAR(r.decrease, Q, 1e-9 * Q);
        } else CHECK(!(largest(q.x, 3 * q.n) > 0));
    }
    end_problem(&q);
}

/* The trust region of a definite matrix; then one that only CG finds to be indefinite. */
static void radius(void) {
    problem q;
    int     k, i, hits = 0;
    start_grid(&q, 24, 23, 1, 200, NULL, 1);
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = way(k, q.solver);
        cloth_linear_report  r;
        double               free_size, last = 0;
        o.fixed = q.fixed;
        o.tolerance = 1e-5;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        free_size = largest(q.x, 3 * q.n);
        for (i = 1; i <= 12; i++) {
            double Q;
            o.radius = free_size * i / 10;
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
            CHECK(r.negative == 0 && largest(q.x, 3 * q.n) <= o.radius * (1 + 1e-5));
            if (r.hit) CHECK_NEAR(largest(q.x, 3 * q.n), o.radius, 1e-5 * o.radius);
            if (i > 11) CHECK(!r.hit);
            hits += r.hit;
            Q = model(&q, NULL);
            CHECK(Q >= last * (1 - 1e-4));
            CHECK_NEAR(r.decrease, Q, 1e-4 * Q);
            last = Q;
        }
    }
    CHECK(hits >= 20);
    CHECK(!falls(&q, q.fixed));
    {   /* couples the differences of two far pairs: no diagonal block and no aggregate sees it */
        double    H[144];
        const int v[4] = {100, 101, 400, 401};
        memset(H, 0, sizeof H);
        for (i = 0; i < 3; i++) {
            const double c = 4e4;
            H[12 * i + 6 + i] = H[12 * (6 + i) + i] = -c;
            H[12 * i + 9 + i] = H[12 * (9 + i) + i] = c;
            H[12 * (3 + i) + 6 + i] = H[12 * (6 + i) + 3 + i] = c;
            H[12 * (3 + i) + 9 + i] = H[12 * (9 + i) + 3 + i] = -c;
        }
        add_both(&q, 4, v, H);
    }
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = way(k, q.solver);
        cloth_linear_report  r;
        o.tolerance = 1e-6;
        o.radius = 0.3;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        CHECK(r.negative && r.hit);
        check_at_radius(&q, &r, 0.3, 1e-6);
    }
    check_downhill(&q, NULL);
    end_problem(&q);
}

/* No mass and no pins: translations cost nothing. With forces that sum to zero there is a
 * solution; the kit must find one, and no saddle. */
static void singular(void) {
    problem q;
    int     k, i;
    start_grid(&q, 24, 23, 0, 10, NULL, 1);
    for (k = 0; k < 3; k++) {
        double sum = 0;
        for (i = k; i < 3 * q.n; i += 3) sum += q.b[i];
        for (i = k; i < 3 * q.n; i += 3) q.b[i] -= sum / q.n;
    }
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = cloth_linear_options_default();
        cloth_linear_report  r;
        double               residual;
        o.method = methods[k];
        q.solver->only = only[k] == 1 ? 0 : only[k];
        o.tolerance = 1e-6;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        model(&q, &residual);
        CHECK(r.negative == 0 && residual < 1e-4);
    }
    cloth_matrix_clear(q.A);                /* nothing at all: said, and no hang */
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = way(k, q.solver);
        cloth_linear_report  r;
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        CHECK(r.negative == 1);
    }
    end_problem(&q);
}

static void not_finite(void) {
    problem q;
    int     k, what;
    double  H[36];
    memset(H, 0, sizeof H);
    for (what = 0; what < 13; what++) {     /* a diagonal, a pair, one outside the pattern, b; such
                                               a pair with a diagonal that is negative; |b|^2; b
                                               and that diagonal; a pair, and no b */
        const double bad = what == 10 ? 1e200 : what & 1 ? HUGE_VAL : (double)NAN;
        const int    outside = what / 2 == 2 || what / 2 == 4, one = 5;
        const int    v[2] = {outside ? 10 : 3, outside ? 500 : 4};
        start_grid(&q, 24, 23, 1, 10, NULL, 0);
        memset(H, 0, sizeof H);
        if (what / 2 == 0) H[4] = bad;
        else H[6 * 4 + 1] = bad;
        if (what / 2 == 0) cloth_matrix_add_element(q.A, 1, &one, H);
        else if ((what / 2 != 3 && what < 10) || what == 12)
            cloth_matrix_add_element(q.A, 2, v, H);
        else q.b[17] = bad;
        if (what == 12) memset(q.b, 0, 3 * (size_t)q.n * sizeof(double));
        memset(H, 0, sizeof H);
        if (what / 2 == 4 || what == 11) H[0] = -1e9, cloth_matrix_add_element(q.A, 1, &one, H);
        for (k = 0; k < 4; k++) {
            cloth_linear_options o = way(k, q.solver);
            cloth_linear_report  r;
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_ERR_NONFINITE);
            CHECK(!(largest(q.x, 3 * q.n) > 0));
        }
        end_problem(&q);
    }
}

/* Large graphs without a dense twin. */
static void check_large(problem *q) {
    int k;
    for (k = 0; k < 4; k++) {
        cloth_linear_options o = way(k, q->solver);
        cloth_linear_report  r;
        o.tolerance = 1e-5;
        CHECK(cloth_linear_solve(q->solver, q->A, q->b, q->x, &o, &r) == CLOTH_OK);
        CHECK(r.negative == 0 && residual(q) <= 1e-3);
    }
}

static void star(void) {
    const int n = test_quick() ? 20001 : 100001;
    int      *start = (int *)zeros((size_t)n, sizeof(int)), i;
    int      *vertex = (int *)zeros(2 * (size_t)n, sizeof(int));
    problem   q;
    for (i = 0; i + 1 < n; i++) {
        start[i + 1] = 2 * (i + 1);
        vertex[2 * i] = n / 2;
        vertex[2 * i + 1] = i < n / 2 ? i : i + 1;
    }
    start_problem(&q, n, n - 1, start, vertex, NULL, 0);
    for (i = 0; i + 1 < n; i++) add_soft(&q, 2, vertex + 2 * i, 5);
    add_mass(&q, 1);
    check_large(&q);
    CHECK(clothi_pattern_domain(q.pattern, n / 2) == -1);
    end_problem(&q);
    free(start);
    free(vertex);
}

/* 700 triangles that hang together with nothing, and 50 vertices in no element. */
static void pieces(void) {
    const int n = 2150;
    int       start[701], vertex[2100], i;
    problem   q;
    for (i = 0; i < 700; i++) start[i + 1] = 3 * (i + 1);
    start[0] = 0;
    for (i = 0; i < 2100; i++) vertex[i] = (7 * i) % 2100;
    start_problem(&q, n, 700, start, vertex, NULL, 0);
    for (i = 0; i < 700; i++) add_soft(&q, 3, vertex + 3 * i, 50);
    add_mass(&q, 1);
    check_large(&q);
    end_problem(&q);
}

/* --- the same bits for every way to cut the loops --- */

typedef struct schedule {
    int                workers, how, calls;
    unsigned long long seed;
} schedule;

static void run_schedule(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    schedule *s = (schedule *)user;
    int       list[512], i;
    s->calls++;
    (void)grain;
    if (count > 512) {
        fn(0, count, 0, ctx);
        return;
    }
    for (i = 0; i < count; i++) list[i] = s->how == 1 ? count - 1 - i : i;
    for (i = count - 1; i > 0 && s->how == 2; i--) {
        const int j = (int)(ref_uniform(&s->seed, 0, 1) * (i + 1)) % (i + 1), t = list[i];
        list[i] = list[j];
        list[j] = t;
    }
    if (s->how == 3) {                      /* whole ranges, one for each worker */
        for (i = 0; i < s->workers; i++)
            if (count * i / s->workers < count * (i + 1) / s->workers)
                fn(count * i / s->workers, count * (i + 1) / s->workers, i, ctx);
        return;
    }
    for (i = 0; i < count; i++) fn(list[i], list[i] + 1, i % s->workers, ctx);
}

static void workers(void) {
    double *first[4] = {NULL, NULL, NULL, NULL};
    int     far, w, k, same = 1;
    for (far = 0; far < 2; far++)
        for (w = -1; w < 16; w++) {
            cloth_hooks hooks;
            schedule    s;
            problem     q;
            memset(&hooks, 0, sizeof hooks);
            memset(&s, 0, sizeof s);
            s.workers = w + 1;
            s.how = (w + 1) % 4;
            s.seed = 3;
            if (w >= 0) {
                hooks.parallel.run = run_schedule;
                hooks.parallel.user = &s;
                hooks.parallel.max_workers = w + 1;
            }
            start_grid(&q, 31, 29, 1, 100, &hooks, 0);
            if (far) add_far(&q, 200);
            for (k = 1; k < 3; k++) {
                const size_t         bytes = 3 * (size_t)q.n * sizeof(double);
                cloth_linear_options o = cloth_linear_options_default();
                q.solver->only = only[k];
                o.tolerance = 1e-3;
                o.radius = k == 2 ? 100 : 0;
                CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_OK);
                if (w < 0) {
                    free(first[k]);
                    first[k] = (double *)zeros(1, bytes);
                    memcpy(first[k], q.x, bytes);
                } else same &= memcmp(first[k], q.x, bytes) == 0;
            }
            CHECK(w < 0 || s.calls > 20);
            end_problem(&q);
        }
    CHECK(same);
    for (k = 0; k < 4; k++) free(first[k]);
}

/* --- memory --- */

typedef struct ration {
    long left, live, calls;
} ration;

static void *ration_alloc(size_t size, void *user) {
    ration *r = (ration *)user;
    r->calls++;
    if (r->left == 0) return NULL;
    if (r->left > 0) r->left--;
    r->live++;
    return malloc(size);
}

static void ration_free(void *p, size_t size, void *user) {
    (void)size;
    ((ration *)user)->live--;
    free(p);
}

static cloth_status everything(const cloth_hooks *hooks, ration *r) {
    int nelem, e, *vertex, *start = grid_elements(24, 23, &nelem, &vertex), i;
    cloth_pattern        *p = NULL;
    cloth_matrix         *A = NULL;
    cloth_linear_solver  *s = NULL;
    cloth_linear_options  o = cloth_linear_options_default();
    static double         b[3 * 24 * 23], x[3 * 24 * 23];
    cloth_status status = cloth_pattern_create(hooks, 24 * 23, nelem, start, vertex, NULL, &p);
    if (status) CHECK(p == NULL);
    if (!status) status = cloth_matrix_create(hooks, p, &A);
    if (!status) status = cloth_linear_solver_create(hooks, p, &s);
    for (i = 0; i < 3 * 24 * 23; i++) b[i] = i % 5;
    for (e = 0; e < 24 * 23 && !status; e++) {
        const double H[36] = {2, 0, 0, -1, 0, 0, 0, 2, 0, 0, -1, 0, 0, 0, 2, 0, 0, -1,
                              -1, 0, 0, 2, 0, 0, 0, -1, 0, 0, 2, 0, 0, 0, -1, 0, 0, 2};
        const int    v[2] = {e, (e * 7 + 100) % (24 * 23)};
        const int    before = A->ne;
        status = cloth_matrix_add_element(A, 2, v, H);
        if (status) CHECK(A->ne == before);
    }
    for (i = 0; i < 4 && !status; i++) {
        o.method = methods[i];
        s->only = only[i];
        status = cloth_linear_solve(s, A, b, x, &o, NULL);
        if (status) CHECK(!(largest(x, 3 * 24 * 23) > 0));
    }
    if (!status && r) {
        const long calls = r->calls;
        for (i = 0; i < 4; i++) {
            o.method = methods[i];
            s->only = only[i];
            CHECK(cloth_linear_solve(s, A, b, x, &o, NULL) == CLOTH_OK);
        }
        CHECK(r->calls == calls);           /* none after the first */
        CHECK(cloth_matrix_bytes(A) > 0 && cloth_linear_solver_bytes(s) > 0);
    }
    cloth_linear_solver_destroy(s);
    cloth_matrix_destroy(A);
    cloth_pattern_destroy(p);
    free(start);
    free(vertex);
    return status;
}

static void memory(void) {
    cloth_hooks  hooks;
    ration       r;
    cloth_status status = CLOTH_ERR_MEMORY;
    long         k;
    memset(&hooks, 0, sizeof hooks);
    hooks.allocator.alloc = ration_alloc;
    hooks.allocator.free = ration_free;
    hooks.allocator.user = &r;
    for (k = 0; k < 500 && status == CLOTH_ERR_MEMORY; k++) {
        memset(&r, 0, sizeof r);
        r.left = k;
        status = everything(&hooks, &r);
        CHECK(status == CLOTH_OK || status == CLOTH_ERR_MEMORY);
        CHECK(r.live == 0);
    }
    CHECK(status == CLOTH_OK && k > 20);
    cloth_linear_solver_destroy(NULL);
    cloth_matrix_destroy(NULL);
    cloth_pattern_destroy(NULL);
}

static void arguments(void) {
    problem              q;
    cloth_pattern       *p = NULL;
    cloth_linear_options o = cloth_linear_options_default();
    const int            start[2] = {0, 2}, below[2] = {-2, 0}, bad[2] = {0, 99}, v[1] = {-1};
    const int            falls[3] = {0, 2, 1};
    double               H[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0};
    static const char *const said[8] = {"method -1", "method 44", "radius -1", "max_iterations -4",
                                        "tolerance -1", "v[0] = -1", "pattern is NULL",
                                        "pattern is NULL"};
    cloth_matrix         *A = NULL;
    cloth_linear_solver  *solver = NULL;
    host                  h;
    cloth_hooks           told = host_hooks(&h);
    int                   k;
    start_grid(&q, 4, 4, 1, 1, NULL, 0);
    CHECK(cloth_pattern_create(NULL, 4, 1, start, bad, NULL, &p) == CLOTH_ERR_ARGUMENT && !p);
    CHECK(cloth_pattern_create(NULL, 4, 1, below, bad + 2, NULL, &p) == CLOTH_ERR_ARGUMENT && !p);
    CHECK(cloth_pattern_create(NULL, 4, 2, falls, v, NULL, &p) == CLOTH_ERR_ARGUMENT && !p);
    CHECK(cloth_pattern_create(NULL, CLOTH_MAX_COUNT + 1, 0, NULL, NULL, NULL, &p) ==
          CLOTH_ERR_ARGUMENT);
    cloth_matrix_clear(NULL);
    CHECK(cloth_pattern_create(NULL, 0, 0, NULL, NULL, NULL, &p) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_pattern_create(NULL, 4, 1, NULL, NULL, NULL, &p) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_matrix_add_element(q.A, 1, v, H) == CLOTH_ERR_ARGUMENT);
    {
        static const int many[50000] = {0}, whole[2] = {0, 50000};
        CHECK(cloth_pattern_create(&told, 4, 1, whole, many, NULL, &p) == CLOTH_ERR_ARGUMENT);
        CHECK(h.lines == 1 && strstr(h.text, "2.5e9 pairs") != NULL);
    }
    CHECK(cloth_linear_solve(NULL, q.A, q.b, q.x, &o, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_linear_solve(q.solver, q.A, q.b, NULL, &o, NULL) == CLOTH_ERR_ARGUMENT);
    o.radius = (double)NAN;
    CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_ERR_ARGUMENT);
    o.radius = HUGE_VAL;
    CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_ERR_ARGUMENT);
    for (k = 0; k < 8; k++) {               /* one option of four, and what was not given */
        o = cloth_linear_options_default();
        if (k < 2) o.method = (cloth_linear)(k ? 44 : -1);
        if (k == 2) o.radius = -1;
        if (k == 3) o.max_iterations = -4;
        if (k == 4) o.tolerance = -1;
        q.solver->hooks.log = told.log;
        q.A->hooks.log = told.log;
        host_forget(&h);
        if (k < 5)
            CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_ERR_ARGUMENT);
        if (k == 5) CHECK(cloth_matrix_add_element(q.A, 1, v, H) == CLOTH_ERR_ARGUMENT);
        if (k == 6) CHECK(cloth_matrix_create(&told, NULL, &A) == CLOTH_ERR_ARGUMENT && !A);
        if (k == 7) CHECK(cloth_linear_solver_create(&told, NULL, &solver) == CLOTH_ERR_ARGUMENT);
        CHECK(h.lines == 1 && strstr(h.text, said[k]) != NULL);
    }
    o = cloth_linear_options_default();
    o.max_iterations = 1;
    o.tolerance = 1e-12;
    CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_OK);
    memset(q.b, 0, 48 * sizeof(double));    /* nothing to solve */
    CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, NULL) == CLOTH_OK);
    CHECK(!(largest(q.x, 48) > 0));
    end_problem(&q);
}

/* Beyond the stiffness that floats carry, AUTO takes doubles and says so. */
static void stiff(void) {
    int k;
    for (k = 0; k < 2; k++) {
        problem              q;
        cloth_linear_options o = cloth_linear_options_default();
        cloth_linear_report  r;
        double               residual;
        start_grid(&q, 24, 23, 1, k ? 1e7 : 1e3, NULL, 1);
        CHECK(cloth_linear_solve(q.solver, q.A, q.b, q.x, &o, &r) == CLOTH_OK);
        CHECK(q.solver->wide == k);
        model(&q, &residual);
        CHECK(r.residual <= 0.05);
        end_problem(&q);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(mul);
    RUN(order);
    RUN(solve_all);
    RUN(beyond_rounding);
    RUN(beyond_coarse);
    RUN(in_place);
    RUN(scales);
    RUN(indefinite);
    RUN(negative_at_once);
    RUN(no_diagonal);
    RUN(radius);
    RUN(singular);
    RUN(not_finite);
    RUN(star);
    RUN(pieces);
    RUN(workers);
    RUN(memory);
    RUN(arguments);
    RUN(stiff);
    return TEST_END();
}
