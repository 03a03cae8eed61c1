/* test_rest.c - triangles laid flat.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_rest.c -lm */
#include "clothsim.h"
#include "test.h"
#include "host.h"

static uint64_t seed = 1;

static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) / 9007199254740992.0;
}

/* edge k of a triangle in space and laid flat, in long double */
static long double edge_in_space(const double *x, const int *f, int k) {
    const double *a = x + 3 * f[k], *b = x + 3 * f[(k + 1) % 3];
    long double   sum = 0;
    int           i;
    for (i = 0; i < 3; i++) {
        const long double d = (long double)b[i] - (long double)a[i];
        sum += d * d;
    }
    return sqrtl(sum);
}

static long double edge_laid_flat(const double *X, int k) {
    const double     *a = X + 2 * k, *b = X + 2 * ((k + 1) % 3);
    const long double u = (long double)b[0] - (long double)a[0];
    const long double v = (long double)b[1] - (long double)a[1];
    return sqrtl(u * u + v * v);
}

/* twice the area in space, in long double */
static long double area2_in_space(const double *x, const int *f) {
    const double *a = x + 3 * f[0], *b = x + 3 * f[1], *c = x + 3 * f[2];
    long double   d[3], e[3], n[3];
    int           i;
    for (i = 0; i < 3; i++) {
        d[i] = (long double)b[i] - (long double)a[i];
        e[i] = (long double)c[i] - (long double)a[i];
    }
    n[0] = d[1] * e[2] - d[2] * e[1];
    n[1] = d[2] * e[0] - d[0] * e[2];
    n[2] = d[0] * e[1] - d[1] * e[0];
    return sqrtl(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

static double area_error(const double *X, const double *x, const int *f) {
    return (double)fabsl((long double)X[2] * (long double)X[5] / area2_in_space(x, f) - 1);
}

/* the largest relative error of an edge; the convention is checked too */
static double worst_edge(int nv, const double *x, int nf, const int *faces) {
    double *X = (double *)malloc(6 * (size_t)nf * sizeof *X), worst = 0;
    int     f, k, n = 0;
    CHECK(cloth_flatten(nv, x, nf, faces, X) == CLOTH_OK);
    for (f = 0; f < nf; f++) {
        const double *P = X + 6 * f;
        n += !(P[0] == 0 && P[1] == 0 && P[2] > 0 && P[3] == 0 && P[5] > 0);
        for (k = 0; k < 3; k++) {
            const long double a = edge_in_space(x, faces + 3 * f, k);
            const double      e = (double)(fabsl(edge_laid_flat(P, k) - a) / a);
            worst = e <= worst ? worst : e;     /* NaN goes through */
        }
    }
    CHECK(n == 0);
    free(X);
    return worst;
}

static void flatten_convention(void) {
    static const double x[] = {5, 5, 5, 5, 8, 5, 1, 5, 5};          /* a 3-4-5 corner */
    static const int    f[] = {0, 1, 2};
    static const double want[] = {0, 0, 3, 0, 0, 4};
    double              X[6];
    int                 k;
    CHECK(cloth_flatten(3, x, 1, f, X) == CLOTH_OK);
    for (k = 0; k < 6; k++) CHECK_NEAR(X[k], want[k], 1e-15);
}

static void flatten_random(void) {
    double x[9], worst = 0;
    int    i, k;
    const int f[] = {0, 1, 2};
    for (i = 0; i < 20000; i++) {
        const double scale = exp(20 * (uniform() - 0.5)), offset = i % 3 ? 0 : 1e5 * uniform();
        for (k = 0; k < 9; k++) x[k] = offset + scale * (uniform() - 0.5);
        worst = fmax(worst, worst_edge(3, x, 1, f));
    }
    printf("  random triangles: worst edge %.2g\n", worst);
    CHECK(worst < 5e-15);
}

/* Caps and needles to 1e-4, each edge as the first, anywhere in space. p and l [4.4] are rounded to
 * 1.1e-16 of the long edge, and the short one is their difference: the bound of the header. */
static void flatten_slivers(void) {
    double      worst = 0, worst_area = 0, error;
    long double shortest, longest;
    int         i, j, k, turn, over = 0;
    for (i = 0; i < 3000; i++) {
        const double thin = pow(10, -4 * uniform()), at = i % 2 ? uniform() : 1e-4 * uniform();
        const double corner[3][2] = {{0, 0}, {1, 0}, {at, thin}};
        double       a[3], b[3], x[9], dot = 0;
        for (k = 0; k < 3; k++) a[k] = uniform() - 0.5;
        for (k = 0; k < 3; k++) b[k] = uniform() - 0.5;
        for (k = 0; k < 3; k++) dot += a[k] * b[k] / (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
        for (k = 0; k < 3; k++) b[k] -= dot * a[k];
        for (j = 0; j < 3; j++)
            for (k = 0; k < 3; k++)
                x[3 * j + k] = 100 * (i % 5) + corner[j][0] * a[k] + corner[j][1] * b[k];
        for (turn = 0; turn < 6; turn++) {
            static const int faces[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1},
                                            {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
            double           X[6];
            error = worst_edge(3, x, 1, faces[turn]);
            shortest = longest = edge_in_space(x, faces[turn], 0);
            for (k = 1; k < 3; k++) {
                shortest = fminl(shortest, edge_in_space(x, faces[turn], k));
                longest = fmaxl(longest, edge_in_space(x, faces[turn], k));
            }
            worst = fmax(worst, error);
            over += !(error <= 1e-15 + 1.2e-16 * (double)(longest / shortest));
            CHECK(cloth_flatten(3, x, 1, faces[turn], X) == CLOTH_OK);
            worst_area = fmax(worst_area, area_error(X, x, faces[turn]));
        }
    }
    printf("  slivers: worst edge %.2g, worst area %.2g\n", worst, worst_area);
    CHECK(over == 0);
    CHECK(worst_area < 3e-12);
}

/* a needle's area comes from its short side, wherever the face starts with a long one: to rounding,
 * not to rounding times long over short (which gives 2e-10 here) */
static void flatten_needle_area(void) {
    double worst = 0;
    int    i, k;
    if (!test_long_double()) SKIP("long double has the bits of double here");
    for (i = 0; i < 1000; i++) {
        static const int faces[2][3] = {{0, 1, 2}, {2, 0, 1}};
        const double     thin = pow(10, -6 * uniform());
        double           x[9], X[6];
        for (k = 0; k < 3; k++) {
            x[k] = uniform();
            x[3 + k] = 2 + uniform();
            x[6 + k] = x[3 + k] + thin * (k == i % 3 ? 1.0 : -0.5);
        }
        for (k = 0; k < 2; k++) {
            CHECK(cloth_flatten(3, x, 1, faces[k], X) == CLOTH_OK);
            worst = fmax(worst, area_error(X, x, faces[k]));
        }
    }
    printf("  needles: worst area %.2g\n", worst);
    CHECK(worst < 5e-13);
}

static void flatten_extreme_sizes(void) {
    static const double scale[] = {1e-305, 1e-200, 1e200, 1e307};
    static const double x[] = {0, 0, 0, 1, 0, 0, 0.25, 0.5, 0.125};
    static const int    f[] = {0, 1, 2};
    size_t              i;
    int                 k;
    for (i = 0; i < sizeof scale / sizeof *scale; i++) {
        double y[9], X[6];
        for (k = 0; k < 9; k++) y[k] = x[k] * scale[i];
        CHECK(cloth_flatten(3, y, 1, f, X) == CLOTH_OK);
        CHECK_REL(X[2], scale[i], 1e-15);
        CHECK_REL(X[4], 0.25 * scale[i], 1e-14);
        CHECK_REL(X[5], sqrt(0.265625) * scale[i], 1e-14);
    }
}

static void flatten_refusals(void) {
    double x[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 0}, X[12], keep[12];
    int    good[] = {0, 1, 2, 1, 3, 2}, bad[] = {0, 1, 2, 0, 1, 4}, flat[] = {0, 1, 2, 0, 1, 3};
    int    repeated[] = {0, 1, 2, 0, 1, 1}, negative[] = {0, 1, 2, 0, -1, 1}, k;
    for (k = 0; k < 12; k++) X[k] = keep[k] = 7;
    CHECK(cloth_flatten(4, NULL, 2, good, X) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(4, x, 2, NULL, X) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(4, x, 2, good, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(-1, x, 2, good, X) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(4, x, -2, good, X) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(4, x, 0x7fffffff, good, X) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(4, x, 2, bad, X) == CLOTH_ERR_MESH);
    CHECK(cloth_flatten(4, x, 2, negative, X) == CLOTH_ERR_MESH);
    CHECK(cloth_flatten(4, x, 2, repeated, X) == CLOTH_ERR_MESH);
    CHECK(cloth_flatten(4, x, 2, flat, X) == CLOTH_ERR_MESH);
    x[10] = HOST_NAN;
    CHECK(cloth_flatten(4, x, 2, good, X) == CLOTH_ERR_NONFINITE);
    x[10] = HOST_INFINITY;
    CHECK(cloth_flatten(4, x, 2, good, X) == CLOTH_ERR_NONFINITE);
    CHECK(memcmp(X, keep, sizeof X) == 0);      /* unchanged on every failure */
    CHECK(cloth_flatten(4, NULL, 0, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_flatten(0, NULL, 0, NULL, NULL) == CLOTH_OK);
}

/* collinear corners whose coordinates are rounded: zero area wherever they lie */
static void flatten_rounded_collinear(void) {
    static const int f[] = {0, 1, 2};
    int              i, k, refused = 0;
    double           x[9], X[6];
    for (i = 0; i < 1000; i++) {
        const double offset = i % 2 ? 1e5 : 0, t = uniform();
        for (k = 0; k < 3; k++) {
            x[k] = offset + uniform();
            x[3 + k] = offset + uniform();
        }
        for (k = 0; k < 3; k++) x[6 + k] = x[k] + t * (x[3 + k] - x[k]);
        refused += cloth_flatten(3, x, 1, f, X) == CLOTH_ERR_MESH;
    }
    CHECK(refused == 1000);
}

static void flatten_shared_meshes(void) {
    static const char *const names[] = {
        "garments/longskirt_f", "garments/longskirt_f_clean", "garments/skirt_f",
        "garments/skirt_f_clean", "garments/trousers_f", "garments/trousers_f_clean",
        "garments/tshirt_f", "garments/tshirt_f_clean", "patterns/shirt_mean_panels",
        "patterns/shirt_mean_welded", "patterns/skirt_2_panels_panels",
        "patterns/skirt_2_panels_welded", "patterns/skirt_8_panels_panels",
        "patterns/skirt_8_panels_welded", "cloth/codim_mat60x20", "cloth/codim_square100",
        "cloth/diffcloth_skirt1252", "cloth/diffcloth_sock482", "cloth/diffcloth_tshirt1900",
        "cloth/ipctk_thickcloth_t0", "cloth/ipctk_thickcloth_t1", "cloth/uipc_cloth80x80",
        "nasty/skirt_f_far_from_origin_1e5", "nasty/skirt_f_tiny_scale_1e-4"};
    double worst = 0;
    size_t i;
    int    seen = 0, faces = 0;
    for (i = 0; i < sizeof names / sizeof *names; i++) {
        char        name[128];
        const char *path;
        cloth_mesh *m = NULL;
        snprintf(name, sizeof name, "data/%s.obj", names[i]);
        path = test_shared(name);
        if (!*path) continue;
        CHECK(cloth_obj_load(NULL, path, NULL, &m) == CLOTH_OK);
        if (!m) continue;
        if (!CHECK(cloth_mesh_check(NULL, m->nv, m->x, m->nf, m->faces, NULL, NULL) == CLOTH_OK))
            printf("%s\n", path);
        worst = fmax(worst, worst_edge(m->nv, m->x, m->nf, m->faces));
        seen++;
        faces += m->nf;
        cloth_mesh_destroy(NULL, m);
    }
    if (!seen) SKIP("the shared data are not here");
    printf("  %d meshes, %d triangles: worst edge %.2g\n", seen, faces, worst);
    CHECK(worst < 1e-12);
}

/* panels drawn flat in metres, read as a pattern: the same triangles as their placement in space
 * where the panel is placed flat, and positive area everywhere */
static void pattern_of_shared_meshes(void) {
    static const char *const names[] = {"shirt_mean", "skirt_2_panels", "skirt_8_panels"};
    cloth_obj_options        opt = cloth_obj_options_default();
    size_t                   i;
    int                      seen = 0;
    opt.pattern_scale = 1;
    opt.parts = CLOTH_OBJ_PARTS_GROUPS;
    for (i = 0; i < sizeof names / sizeof *names; i++) {
        static const int panels[] = {8, 2, 8};
        char             name[128];
        const char      *path;
        cloth_mesh      *m = NULL;
        double           sum = 0, worst = 0;
        int              f, k;
        snprintf(name, sizeof name, "data/patterns/%s_panels.obj", names[i]);
        path = test_shared(name);
        if (!*path) continue;
        CHECK(cloth_obj_load(NULL, path, &opt, &m) == CLOTH_OK);
        if (!m) continue;
        seen++;
        CHECK(m->X && m->npart == panels[i]);
        CHECK(cloth_mesh_check(NULL, m->nv, m->x, m->nf, m->faces, m->X, NULL) == CLOTH_OK);
        for (f = 0; f < m->nf; f++) {
            const double *P = m->X + 6 * f;
            sum += 0.5 * (P[2] * (P[5] - P[1]) - P[4] * (P[3] - P[1]) - P[0] * (P[5] - P[3]));
            for (k = 0; k < 3; k++)
                worst = fmax(worst, fabs((double)(edge_laid_flat(P, k) -
                                                  edge_in_space(m->x, m->faces + 3 * f, k))));
        }
        printf("  %s: pattern area %.4f m^2, placement differs by %.2g m\n", names[i], sum, worst);
        CHECK_NEAR(sum, i == 0 ? 0.640 : i == 1 ? 0.684 : 0.896, 0.0006);
        cloth_mesh_destroy(NULL, m);
    }
    if (!seen) SKIP("the shared data are not here");
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(flatten_convention);
    RUN(flatten_random);
    RUN(flatten_slivers);
    RUN(flatten_needle_area);
    RUN(flatten_extreme_sizes);
    RUN(flatten_refusals);
    RUN(flatten_rounded_collinear);
    RUN(flatten_shared_meshes);
    RUN(pattern_of_shared_meshes);
    return TEST_END();
}
