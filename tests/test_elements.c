/* test_elements.c - springs, triangles, hinges: derivatives, closed forms, degenerate states.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_elements.c -lm && ./test_elements */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"

#include "test.h"
#include "reference.h"

static const double pi = 3.14159265358979323846;

static void random_points(unsigned long long *seed, int n, double size, double *x) {
    int i;
    for (i = 0; i < n; i++) x[i] = ref_uniform(seed, -size, size);
}

/* A rest triangle with the heights not below 0.05. */
static void random_rest(unsigned long long *seed, double *X) {
    do {
        random_points(seed, 6, 1, X);
    } while (fabs((X[2] - X[0]) * (X[5] - X[1]) - (X[4] - X[0]) * (X[3] - X[1])) < 0.1);
}

static double moduli(unsigned long long *seed, double *lambda) {
    const double mu = ref_uniform(seed, 0.1, 10);
    *lambda = ref_uniform(seed, -0.5, 3) * mu;
    return mu;
}

/* Hinge with feet t, heights h, angle theta (positive convex, normals towards +z), moved. */
static void make_hinge(unsigned long long *seed, double l, const double *t, const double *h,
                       double theta, double *x) {
    double R[9], shift[3];
    memset(x, 0, 12 * sizeof *x);
    x[3] = l;
    x[6] = t[0] * l;
    x[7] = h[0];
    x[9] = t[1] * l;
    x[10] = -h[1] * cos(theta);
    x[11] = -h[1] * sin(theta);
    if (!seed) return;
    ref_rotation(seed, R);
    random_points(seed, 3, 1, shift);
    ref_move(R, shift, 4, x);
}

/* ---- spring --------------------------------------------------------------------------------- */

static void spring_derivatives(void) {
    unsigned long long seed = 1;
    int                k, i;
    for (k = 0; k < 50; k++) {
        double     x[6], g[6], H[36], gr[6], Hr[36], l;
        ref_spring s;
        random_points(&seed, 6, 1, x);
        l = sqrt(pow(x[3] - x[0], 2) + pow(x[4] - x[1], 2) + pow(x[5] - x[2], 2));
        if (k >= 40)                        /* short: 1e-4 of the rest length */
            for (i = 0; i < 3; i++) x[3 + i] = x[i] + (x[3 + i] - x[i]) / l * 1e-4;
        if (k >= 40) l = 1e-4;
        s.L = k % 10 == 0 ? 0.0 : k < 40 ? ref_uniform(&seed, 0.2, 2) * l : 1.0;
        s.k = ref_uniform(&seed, 1, 100);
        CHECK_REL(cloth_spring(x, s.L, s.k, g, H, 0), 0.5 * s.k * (l - s.L) * (l - s.L), 1e-9);
        ref_gradient(ref_spring_energy, &s, x, 6, 0.02 * l, gr);
        ref_hessian(ref_spring_energy, &s, x, 6, 0.02 * l, Hr);
        CHECK(ref_difference(g, gr, 6) < 1e-8);
        CHECK(ref_difference(H, Hr, 36) < 1e-6);
        cloth_spring(x, s.L, s.k, gr, Hr, 1);
        CHECK(ref_difference(gr, g, 6) <= 0.0);
        CHECK(ref_smallest_eigenvalue(Hr, 6) > -1e-12);
        if (l > s.L) CHECK(ref_difference(Hr, H, 36) <= 1e-15);
    }
}

static void spring_degenerate(void) {
    double x[6] = {1, 2, 3, 1, 2, 3}, g[6], H[36];
    CHECK_REL(cloth_spring(x, 2.0, 3.0, g, H, 0), 6.0, 1e-15);
    CHECK(ref_difference(g, g + 3, 3) <= 0.0 && g[0] >= 0.0 && g[0] <= 0.0);
    CHECK(clothi_find_nonfinite(H, 36) < 0);
    cloth_spring(x, 0.0, 3.0, g, H, 0);
    CHECK_REL(H[0], 3.0, 1e-15);
    cloth_spring(x, 2.0, 3.0, g, H, 1);
    CHECK(ref_smallest_eigenvalue(H, 6) > -1e-12);
    x[0] = 1e200;
    CHECK_REL(cloth_spring(x, 2.0, 3.0, g, H, 0), CLOTHI_HUGE, 0.0);
    CHECK(clothi_find_nonfinite(g, 6) < 0);
}

/* ---- triangle ------------------------------------------------------------------------------- */

/* kinds of state: 0 random, 1 near rest, 2 strong compression, 3 height 1e-4, 4 on a line */
static void make_triangle(unsigned long long *seed, int kind, const double *X, double *x) {
    double R[9], shift[3];
    int    i;
    if (kind == 0) {
        random_points(seed, 9, 1.5, x);
        return;
    }
    for (i = 0; i < 3; i++) {
        x[3 * i] = X[2 * i];
        x[3 * i + 1] = X[2 * i + 1];
        x[3 * i + 2] = 0;
    }
    if (kind == 1)
        for (i = 0; i < 9; i++) x[i] += ref_uniform(seed, -0.02, 0.02);
    if (kind == 2)
        for (i = 0; i < 9; i++) x[i] *= ref_uniform(seed, 0.3, 0.5);
    if (kind >= 3) {
        const double h = kind == 3 ? 1e-4 : 0.0, t = ref_uniform(seed, -0.2, 1.2);
        for (i = 0; i < 3; i++) x[6 + i] = x[i] + t * (x[3 + i] - x[i]);
        x[8] += h;
    }
    ref_rotation(seed, R);
    random_points(seed, 3, 1, shift);
    ref_move(R, shift, 3, x);
}

static void stretch_derivatives(void) {
    unsigned long long seed = 2;
    int                k;
    for (k = 0; k < 200; k++) {
        double      x[9], g[9], H[81], gr[9], Hr[81];
        ref_real    y[9];
        ref_stretch s;
        int         i;
        random_rest(&seed, s.X);
        s.mu = moduli(&seed, &s.lambda);
        make_triangle(&seed, k % 5, s.X, x);
        for (i = 0; i < 9; i++) y[i] = (ref_real)x[i];
        CHECK_NEAR(cloth_stretch(x, s.X, s.mu, s.lambda, g, H, 0),
                   (double)ref_stretch_energy(y, &s),
                   1e-13 * (s.mu + (double)ref_stretch_energy(y, &s)));
        ref_gradient(ref_stretch_energy, &s, x, 9, 1e-2, gr);
        ref_hessian(ref_stretch_energy, &s, x, 9, 1e-2, Hr);
        CHECK(ref_difference(g, gr, 9) < 1e-8);
        CHECK(ref_difference(H, Hr, 81) < 1e-6);
        CHECK_REL(cloth_stretch(x, s.X, s.mu, s.lambda, NULL, NULL, 0),
                  cloth_stretch(x, s.X, s.mu, s.lambda, gr, Hr, 1), 0.0);
        CHECK(ref_difference(gr, g, 9) <= 0.0);
    }
}

static void stretch_psd(void) {
    unsigned long long seed = 3;
    int                k, i, same = 0;
    for (k = 0; k < 300; k++) {
        double X[6], x[9], H[81], P[81], D[81], S[4], mu, lambda;
        random_rest(&seed, X);
        mu = moduli(&seed, &lambda);
        make_triangle(&seed, k % 5, X, x);
        cloth_stretch(x, X, mu, lambda, NULL, H, 0);
        cloth_stretch(x, X, mu, lambda, NULL, P, 1);
        CHECK(ref_smallest_eigenvalue(P, 9) > -1e-12);
        for (i = 0; i < 81; i++) D[i] = P[i] - H[i];
        /* it only adds: P - H is positive semidefinite too */
        CHECK(ref_difference(P, H, 81) < 1e-13 || ref_smallest_eigenvalue(D, 9) > -1e-10);
        cloth_stretch_state(x, X, mu, lambda, NULL, NULL, S, NULL);
        if (S[0] > 0 && S[0] * S[3] - S[1] * S[2] > 0) {
            CHECK(ref_difference(P, H, 81) < 1e-12);
            same++;
        }
    }
    CHECK(same > 20);
}

/* F over the rest triangle of unit legs */
static double state_of(const double *F, double mu, double lambda, double *P) {
    static const double X[6] = {0, 0, 1, 0, 0, 1};
    double              x[9] = {0}, g[9], S[4], f[6], area = 0.5;
    int                 i;
    for (i = 0; i < 2; i++) {
        x[3 + i] = F[2 * i];
        x[6 + i] = F[2 * i + 1];
    }
    (void)f;
    cloth_stretch(x, X, mu, lambda, g, NULL, 0);
    for (i = 0; i < 2; i++) {               /* P = dW/dF: its columns are the forces on 1 and 2 */
        P[2 * i] = g[3 + i] / area;
        P[2 * i + 1] = g[6 + i] / area;
    }
    CHECK_NEAR(cloth_stretch_state(x, X, mu, lambda, f, NULL, S, NULL), area, 1e-15);
    for (i = 0; i < 4; i++) {               /* P = F S */
        const int r = i / 2, c = i % 2;
        CHECK_NEAR(P[i], F[2 * r] * S[c] + F[2 * r + 1] * S[2 + c], 1e-12 * (1 + fabs(P[i])));
    }
    return cloth_stretch(x, X, mu, lambda, NULL, NULL, 0) / area;
}

static void stretch_closed_forms(void) {
    static const double stretch[5] = {0.3, 0.57735026918962576, 0.9, 1.1, 1.6};
    const double        Y = 1000, nu = 0.3;
    const double        mu = Y / (2 * (1 + nu)), lambda = Y * nu / (1 - nu * nu);
    int                 k, i;
    for (k = 0; k < 5; k++) {
        const double l = stretch[k], e = (l * l - 1) / 2;
        double       F[4] = {0, 0, 0, 0}, P[4], x[9], f[6], st[2];
        static const double X[6] = {0, 0, 1, 0, 0, 1};
        F[0] = l;                           /* free sides: Y and nu come back */
        F[3] = sqrt(1 - nu * (l * l - 1));
        CHECK_REL(state_of(F, mu, lambda, P), Y * e * e / 2, 1e-12);
        CHECK_REL(P[0], Y * l * e, 1e-12);
        CHECK_NEAR(P[3], 0.0, 1e-12 * Y);
        F[3] = 1;                           /* held sides */
        CHECK_REL(state_of(F, mu, lambda, P), (lambda + 2 * mu) * e * e / 2, 1e-12);
        CHECK_REL(P[0], (lambda + 2 * mu) * l * e, 1e-12);
        CHECK_REL(P[3], lambda * e, 1e-12);
        F[3] = l;                           /* equibiaxial */
        CHECK_REL(state_of(F, mu, lambda, P), Y / (1 - nu) * e * e, 1e-12);
        CHECK_REL(P[0], Y / (1 - nu) * e * l, 1e-12);
        F[0] = F[3] = 1;                    /* simple shear */
        F[1] = l;
        state_of(F, mu, lambda, P);
        CHECK_REL(P[0], lambda * l * l / 2 + mu * l * l, 1e-12);
        CHECK_REL(P[1], mu * l + (lambda / 2 + mu) * l * l * l, 1e-12);
        CHECK_REL(P[2], mu * l, 1e-12);
        CHECK_REL(P[3], (lambda / 2 + mu) * l * l, 1e-12);
        memset(x, 0, sizeof x);             /* principal stretches of a known F */
        x[3] = l;
        x[7] = 1e-9;
        cloth_stretch_state(x, X, mu, lambda, f, NULL, NULL, st);
        CHECK_REL(st[0], l, 1e-14);
        CHECK_REL(st[1], 1e-9, 1e-12);
        CHECK_REL(f[0], l, 1e-15);
        for (i = 0; i < 40; i++) {          /* the large one first where both are one */
            memset(x, 0, sizeof x);
            x[3] = x[7] = l * cos(i), x[6] = -l * sin(i), x[4] = l * sin(i);
            cloth_stretch_state(x, X, mu, lambda, NULL, NULL, NULL, st);
            CHECK(st[0] >= st[1]);
            CHECK_REL(st[0], l, 1e-14);
        }
    }
}

/* Rows of the shared table stvk_states.csv: W and P of 600 states with Green strain (half). */
static void stretch_table(void) {
    const char *path = test_shared("refdata/stvk_states.csv");
    FILE       *file = *path ? fopen(path, "r") : NULL;
    char        line[1024], name[64], lame[32], strain[16];
    int         rows = 0;
    if (!file) SKIP("no shared refdata/stvk_states.csv");
    while (fgets(line, sizeof line, file)) {
        double Y, nu, param, F[4], W, Pr[4], P[4], mu, lambda;
        int    i;
        for (i = 0; line[i]; i++)
            if (line[i] == ',') line[i] = ' ';
        if (sscanf(line, "%63s %31s %15s %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf %lf", name,
                   lame, strain, &Y, &nu, &param, F, F + 1, F + 2, F + 3, &W, Pr, Pr + 1, Pr + 2,
                   Pr + 3) != 15)
            continue;
        mu = Y / (2 * (1 + nu));
        lambda = strcmp(lame, "lame3D") == 0 ? Y * nu / ((1 + nu) * (1 - 2 * nu))
                                             : Y * nu / (1 - nu * nu);
        if (strcmp(strain, "half") != 0) {  /* E = F'F - I is four times the moduli */
            mu *= 4;
            lambda *= 4;
        }
        rows++;
        CHECK_NEAR(state_of(F, mu, lambda, P), W, 1e-12 * (1 + fabs(W)));
        for (i = 0; i < 4; i++) CHECK_NEAR(P[i], Pr[i], 1e-12 * (mu + lambda + fabs(Pr[i])));
    }
    fclose(file);
    CHECK(rows >= 100);
}

static void stretch_invariance(void) {
    unsigned long long seed = 4;
    int                k, i, r;
    for (k = 0; k < 100; k++) {
        double X[6], x[9], y[9], g[9], R[9], shift[3], mu, lambda, big = 0, E0, f[3], t[3];
        random_rest(&seed, X);
        mu = moduli(&seed, &lambda);
        for (i = 0; i < 9; i++) y[i] = i % 3 < 2 ? X[2 * (i / 3) + i % 3] : 0.0;
        ref_rotation(&seed, R);
        random_points(&seed, 3, 1, shift);
        ref_move(R, shift, 3, y);           /* at rest anywhere: nothing */
        CHECK_NEAR(cloth_stretch(y, X, mu, lambda, g, NULL, 0), 0.0, 1e-28 * (mu + lambda));
        for (i = 0; i < 9; i++) CHECK_NEAR(g[i], 0.0, 1e-13 * (mu + fabs(lambda)));
        make_triangle(&seed, k % 4, X, x);
        E0 = cloth_stretch(x, X, mu, lambda, g, NULL, 0);
        for (r = 0; r < 3; r++) {
            const int a = (r + 1) % 3, b = (r + 2) % 3;
            f[r] = t[r] = 0;
            for (i = 0; i < 3; i++) {
                f[r] += g[3 * i + r];
                t[r] += x[3 * i + a] * g[3 * i + b] - x[3 * i + b] * g[3 * i + a];
                big += fabs(g[3 * i + r]);
            }
        }
        for (r = 0; r < 3; r++) CHECK(fabs(f[r]) < 1e-13 * big && fabs(t[r]) < 1e-12 * big);
        ref_move(R, shift, 3, x);
        CHECK_REL(cloth_stretch(x, X, mu, lambda, NULL, NULL, 0), E0, 1e-12);
    }
}

static void stretch_degenerate(void) {
    static const double line[6] = {0, 0, 1, 1, 2, 2}, unit[6] = {0, 0, 1, 0, 0, 1};
    double              x[9] = {0}, g[9], H[81], F[6], st[2];
    int                 i;
    for (i = 0; i < 9; i++) x[i] = 0.1 * i * i;
    CHECK_NEAR(cloth_stretch(x, line, 1, 1, g, H, 0), 0.0, 0.0);
    for (i = 0; i < 81; i++) CHECK_NEAR(H[i], 0.0, 0.0);
    CHECK_NEAR(cloth_stretch_state(x, line, 1, 1, F, NULL, NULL, st), 0.0, 0.0);
    memset(x, 0, sizeof x);                 /* all corners at one point: E = -I/2 */
    CHECK_REL(cloth_stretch(x, unit, 2, 1, g, H, 0), 0.5 * (2 * 0.5 + 0.5), 1e-15);
    for (i = 0; i < 9; i++) CHECK_NEAR(g[i], 0.0, 0.0);
    cloth_stretch(x, unit, 2, 1, g, H, 1);
    for (i = 0; i < 81; i++) CHECK_NEAR(H[i], 0.0, 0.0);
    x[3] = 1e200;
    CHECK_REL(cloth_stretch(x, unit, 2, 1, g, H, 0), CLOTHI_HUGE, 0.0);
    CHECK(clothi_find_nonfinite(g, 9) < 0 && clothi_find_nonfinite(H, 81) < 0);
    cloth_stretch_state(x, unit, 2, 1, NULL, NULL, NULL, st);
    CHECK_REL(st[0], 1e200, 1e-14);
}

/* ---- hinge ---------------------------------------------------------------------------------- */

static void hinge_compare(const double *x, const ref_hinge *h, double step) {
    double   g[12], H[144], gr[12], Hr[144], theta;
    ref_real y[12];
    int      i;
    for (i = 0; i < 12; i++) y[i] = (ref_real)x[i];
    theta = cloth_dihedral_hess(x, g, H);
    CHECK_NEAR(theta, (double)ref_dihedral(y), 1e-11);
    CHECK_REL(cloth_dihedral(x), theta, 0.0);
    ref_gradient(ref_dihedral_fn, NULL, x, 12, step, gr);
    ref_hessian(ref_dihedral_fn, NULL, x, 12, step, Hr);
    CHECK(ref_difference(g, gr, 12) < 1e-8);
    CHECK(ref_difference(H, Hr, 144) < 1e-6);
    CHECK_NEAR(cloth_bend(x, h->c, h->theta0, g, H, 0), (double)ref_hinge_energy(y, h),
               1e-10 * h->c);
    ref_gradient(ref_hinge_energy, h, x, 12, step, gr);
    ref_hessian(ref_hinge_energy, h, x, 12, step, Hr);
    CHECK(ref_difference(g, gr, 12) < 1e-8);
    CHECK(ref_difference(H, Hr, 144) < 1e-6);
    CHECK_REL(cloth_bend(x, h->c, h->theta0, gr, Hr, 1),
              cloth_bend(x, h->c, h->theta0, NULL, NULL, 0), 0.0);
    CHECK(ref_difference(gr, g, 12) <= 0.0);
    CHECK(ref_smallest_eigenvalue(Hr, 12) > -1e-12);
}

static void hinge_derivatives(void) {
    unsigned long long seed = 5;
    int                k;
    for (k = 0; k < 200; k++) {
        double    x[12], t[2], h[2], theta;
        ref_hinge hinge;
        theta = k % 4 == 0 ? ref_uniform(&seed, -3.12, 3.12) : ref_uniform(&seed, -0.5, 0.5);
        if (k % 4 == 1)                     /* folded, up to 0.02 from pi */
            theta = (theta > 0 ? 1 : -1) * (pi - 0.02 - fabs(theta) / 10);
        t[0] = ref_uniform(&seed, -1, 2);
        t[1] = ref_uniform(&seed, -1, 2);
        h[0] = ref_uniform(&seed, 0.2, 1.5);
        h[1] = ref_uniform(&seed, 0.2, 1.5);
        hinge.c = ref_uniform(&seed, 0.1, 3);
        hinge.theta0 = k % 3 ? ref_uniform(&seed, -2, 2) : 0.0;
        make_hinge(&seed, ref_uniform(&seed, 0.5, 1.5), t, h, theta, x);
        hinge_compare(x, &hinge, 2e-3);
    }
}

static void hinge_near_degenerate(void) {
    unsigned long long seed = 6;
    int                k;
    for (k = 0; k < 60; k++) {
        double    x[12], t[2], h[2];
        ref_hinge hinge = {1.0, 0.3};
        const double small = k % 2 ? 1e-4 : 1e-3;
        const int kind = k % 3;
        t[0] = ref_uniform(&seed, -0.5, 1.5);
        t[1] = ref_uniform(&seed, -0.5, 1.5);
        h[0] = kind == 0 ? small : 1.0;
        h[1] = kind <= 1 ? small : 1.0;
        if (kind == 2) {                    /* a short edge */
            t[0] /= small;
            t[1] /= small;
        }
        make_hinge(NULL, kind == 2 ? small : 1.0, t, h, ref_uniform(&seed, -2.8, 2.8), x);
        hinge_compare(x, &hinge, 0.02 * small);
    }
}

static void hinge_sign(void) {
    static const double foot[2] = {0.5, 0.5}, height[2] = {1, 1};
    double              x[12], y[12];
    int                 k;
    for (k = -30; k <= 30; k++) {
        make_hinge(NULL, 1.0, foot, height, 0.1 * k, x);
        CHECK_NEAR(cloth_dihedral(x), 0.1 * k, 1e-15);
        memcpy(y, x, sizeof y);             /* the other direction of the edge, the same side */
        memcpy(y, x + 3, 3 * sizeof *y);
        memcpy(y + 3, x, 3 * sizeof *y);
        memcpy(y + 6, x + 9, 3 * sizeof *y);
        memcpy(y + 9, x + 6, 3 * sizeof *y);
        CHECK_NEAR(cloth_dihedral(y), 0.1 * k, 1e-15);
        memcpy(y, x, 6 * sizeof *y);        /* seen from the other side: the other sign */
        CHECK_NEAR(cloth_dihedral(y), -0.1 * k, 1e-15);
    }
    make_hinge(NULL, 1.0, foot, height, 0, x);
    x[8] = x[11] = -1e-9;                   /* corners below the edge: convex from above */
    CHECK_REL(cloth_dihedral(x), 2e-9, 1e-14);
    /* the difference is not wrapped: from -3 to 3 is 6, not 2 pi - 6 the short way */
    make_hinge(NULL, 1.0, foot, height, 3.0, x);
    CHECK_REL(cloth_bend(x, 2.0, -3.0, NULL, NULL, 0), 36.0, 1e-13);
}

/* On an equilateral patch a cylinder of any direction costs D k^2/2 an area. */
static void hinge_cylinder(void) {
    const double D = 1.5, L = 1.0, kappa = 1e-3, h = L * sqrt(3.0) / 2;
    const double area = sqrt(3.0) / 4 * L * L;
    int          degrees, quadratic, k, i;
    for (quadratic = 0; quadratic < 2; quadratic++)
        for (degrees = 0; degrees < 180; degrees += 15) {
            const double a = degrees * pi / 180;
            double       E = 0;
            for (k = 0; k < 3; k++) {       /* one hinge of each edge direction a vertex */
                const double edge = k * pi / 3, foot[2] = {0.5, 0.5};
                const double height[2] = {h, h};
                double       x[12], rest[12], w[4];
                const double c = cloth_hinge_coefficient(D, L * L, area, area);
                make_hinge(NULL, L, foot, height, 0, rest);
                for (i = 0; i < 4; i++) {
                    const double px = rest[3 * i] - L / 2, py = rest[3 * i + 1];
                    const double X = px * cos(edge) - py * sin(edge);
                    const double Z = px * sin(edge) + py * cos(edge);
                    const double s = X * cos(a) + Z * sin(a), z = -X * sin(a) + Z * cos(a);
                    x[3 * i] = sin(s * kappa) / kappa;
                    x[3 * i + 1] = z;
                    x[3 * i + 2] = (cos(s * kappa) - 1) / kappa;
                }
                cloth_bend_quadratic_weights(rest, w);
                E += quadratic ? cloth_bend_quadratic(x, w, c, NULL, NULL)
                               : cloth_bend(x, c, 0, NULL, NULL, 0);
            }
            CHECK_REL(2 * E / (kappa * kappa * 2 * area), 1.5, 1e-5);
        }
}

static void hinge_invariance(void) {
    unsigned long long seed = 7;
    int                k, i, r;
    for (k = 0; k < 100; k++) {
        double x[12], g[12], R[9], shift[3], E0, big = 0, theta0 = ref_uniform(&seed, -1, 1);
        double foot[2] = {0.3, 0.8}, height[2] = {0.7, 1.1}, angle = ref_uniform(&seed, -3, 3);
        make_hinge(&seed, 1.0, foot, height, angle, x);
        CHECK_NEAR(cloth_dihedral(x), angle, 1e-13);
        E0 = cloth_bend(x, 1.0, theta0, g, NULL, 0);
        for (i = 0; i < 12; i++) big += fabs(g[i]);
        for (r = 0; r < 3; r++) {
            const int a = (r + 1) % 3, b = (r + 2) % 3;
            double    f = 0, t = 0;
            for (i = 0; i < 4; i++) {
                f += g[3 * i + r];
                t += x[3 * i + a] * g[3 * i + b] - x[3 * i + b] * g[3 * i + a];
            }
            CHECK(fabs(f) < 1e-13 * big && fabs(t) < 1e-12 * big);
        }
        ref_rotation(&seed, R);
        random_points(&seed, 3, 1, shift);
        ref_move(R, shift, 4, x);
        CHECK_NEAR(cloth_bend(x, 1.0, theta0, g, NULL, 0), E0, 1e-12);
        cloth_bend(x, 1.0, cloth_dihedral(x), g, NULL, 0);
        for (i = 0; i < 12; i++) CHECK_NEAR(g[i], 0.0, 0.0);
    }
}

static void hinge_degenerate(void) {
    static const double foot[2] = {0.3, 0.7}, height[2] = {1, 0.5};
    double              x[12], y[12], g[12], gs[12], H[144], last = 1e300;
    int                 i, k;
    memset(x, 0, sizeof x);                 /* all corners at one point */
    CHECK_NEAR(cloth_dihedral_hess(x, g, H), 0.0, 0.0);
    for (i = 0; i < 12; i++) CHECK_NEAR(g[i], 0.0, 0.0);
    CHECK(clothi_find_nonfinite(H, 144) < 0);
    make_hinge(NULL, 1.0, foot, height, 0.4, x);
    memcpy(y, x, sizeof y);
    memcpy(y + 6, x, 3 * sizeof *y);        /* a corner on an edge end: theta counts as 0 */
    CHECK_NEAR(cloth_bend(y, 2.0, 0.5, g, H, 0), 0.25, 0.0);
    CHECK(clothi_find_nonfinite(g, 12) < 0 && clothi_find_nonfinite(H, 144) < 0);
    for (i = 0; i < 3; i++) CHECK_NEAR(g[6 + i], 0.0, 0.0);
    memcpy(y, x, sizeof y);
    memcpy(y + 3, x, 3 * sizeof *y);        /* an edge of no length */
    CHECK_NEAR(cloth_bend(y, 2.0, 0.5, g, H, 0), 0.25, 0.0);
    CHECK(clothi_find_nonfinite(g, 12) < 0 && clothi_find_nonfinite(H, 144) < 0);
    memcpy(y, x, sizeof y);
    memcpy(y + 9, x + 3, 3 * sizeof *y);    /* the other corner on the other end */
    CHECK_NEAR(cloth_dihedral(y), 0.0, 0.0);
    for (k = 0; k < 40; k++) {              /* falling height: 1/h, then fading to zero */
        const double tall[2] = {pow(10, -0.25 * k - 4), 1};
        make_hinge(NULL, 1.0, foot, tall, 0.4, y);
        cloth_dihedral_grad(y, g);
        if (tall[0] > 2e-6) CHECK_REL(fabs(g[8]), 1 / tall[0], 1e-10);
        if (tall[0] < 1e-6) CHECK(fabs(g[8]) < last);
        CHECK(fabs(g[8]) < 1.5e6);
        last = fabs(g[8]);
    }
    cloth_dihedral_hess(x, gs, NULL);
    for (k = -100; k <= 100; k += 10) {     /* theta does not depend on size, also far out */
        const double s = pow(10, 3.0 * k);
        for (i = 0; i < 12; i++) y[i] = x[i] * s;
        CHECK_REL(cloth_dihedral_hess(y, g, H), 0.4, 1e-13);
        for (i = 0; i < 12; i++) g[i] *= s;
        CHECK(ref_difference(g, gs, 12) < 1e-12);
        CHECK(clothi_find_nonfinite(H, 144) < 0);
    }
    make_hinge(NULL, 1.0, foot, height, pi, x);
    CHECK_NEAR(fabs(cloth_dihedral_hess(x, g, H)), pi, 1e-15);
    CHECK(clothi_find_nonfinite(g, 12) < 0 && clothi_find_nonfinite(H, 144) < 0);
    CHECK_NEAR(cloth_hinge_coefficient(1, 1, 0, 0), 0.0, 0.0);
}

/* ---- quadratic bending ---------------------------------------------------------------------- */

static void quadratic_is_the_flat_hinge(void) {
    unsigned long long seed = 8;
    int                k, i, j, r, s;
    for (k = 0; k < 50; k++) {
        const double  foot[2] = {ref_uniform(&seed, -1, 2), ref_uniform(&seed, -1, 2)};
        const double  height[2] = {ref_uniform(&seed, 0.2, 1.5), ref_uniform(&seed, 0.2, 1.5)};
        double        rest[12], folded[12], x[12], w[4], wf[4], g[12], H[144], Hh[144], gr[12];
        double        Hr[144];
        ref_quadratic q;
        make_hinge(NULL, 1.0, foot, height, 0, rest);
        make_hinge(&seed, 1.0, foot, height, 2.0, folded);
        cloth_bend_quadratic_weights(rest, w);
        cloth_bend_quadratic_weights(folded, wf);
        CHECK(ref_difference(wf, w, 4) < 1e-13);
        CHECK_NEAR(cloth_bend_quadratic(rest, w, 2.5, g, H), 0.0, 1e-28);
        cloth_bend(rest, 2.5, 0, NULL, Hh, 0);
        for (i = 0; i < 4; i++)
            for (j = 0; j < 4; j++)
                for (r = 0; r < 3; r++)
                    for (s = 0; s < 3; s++) {
                        const double a = H[12 * (3 * i + r) + 3 * j + s];
                        const double b = Hh[12 * (3 * i + r) + 3 * j + s];
                        if (r == 2 && s == 2) CHECK_NEAR(a, b, 1e-12 * fabs(H[0]));
                        if (r != s) CHECK_NEAR(a, 0.0, 0.0);
                    }
        random_points(&seed, 12, 1, x);
        memcpy(q.foot, foot, sizeof foot);
        memcpy(q.height, height, sizeof height);
        q.c = 2.5;
        cloth_bend_quadratic(x, w, q.c, g, H);
        ref_gradient(ref_quadratic_energy, &q, x, 12, 1e-2, gr);
        ref_hessian(ref_quadratic_energy, &q, x, 12, 1e-2, Hr);
        CHECK(ref_difference(g, gr, 12) < 1e-8);
        CHECK(ref_difference(H, Hr, 144) < 1e-6);
        CHECK(ref_smallest_eigenvalue(H, 12) > -1e-12);
    }
    {
        double flat[12] = {0}, w[4];
        cloth_bend_quadratic_weights(flat, w);
        CHECK_NEAR(fabs(w[0]) + fabs(w[1]) + fabs(w[2]) + fabs(w[3]), 0.0, 0.0);
    }
}

/* ---- eight at a time ------------------------------------------------------------------------ */

enum { LANES = CLOTHI_LANES };

static void to_lane(const double *v, int n, int lane, double *batch) {
    int i;
    for (i = 0; i < n; i++) batch[i * LANES + lane] = v[i];
}

static void from_lane(const double *batch, int n, int lane, double *v) {
    int i;
    for (i = 0; i < n; i++) v[i] = batch[i * LANES + lane];
}

/* The full symmetric matrix of corners x corners blocks from one triangle of them. */
static void full_hessian(const double *H, int corners, int lane, double *full) {
    int p, k, end, n = 3 * corners;
    memset(full, 0, (size_t)(n * n) * sizeof *full);
    for (p = 0; p < corners * (corners - 1) / 2; p++)
        for (k = 0; k < 9; k++) {
            const double h = H[(9 * p + k) * LANES + lane];
            const int    i = 3 * clothi_pair[p][0] + k / 3, j = 3 * clothi_pair[p][1] + k % 3;
            full[n * i + j] = full[n * j + i] = h;
            for (end = 0; end < 2; end++)   /* a move of all corners changes nothing */
                full[n * (3 * clothi_pair[p][end] + (end ? k % 3 : k / 3)) +
                     3 * clothi_pair[p][end] + (end ? k / 3 : k % 3)] -= h;
        }
}

static void lanes_stretch(void) {
    unsigned long long seed = 10;
    int                round, k, psd;
    for (round = 0; round < 60; round++) {
        double x[9 * LANES], rest[7 * LANES], E[LANES], Ed[LANES], f[9 * LANES], H[27 * LANES];
        double X[LANES][6], y[LANES][9], mu[LANES], lambda[LANES];
        for (k = 0; k < LANES; k++) {
            double B[5];
            random_rest(&seed, X[k]);
            mu[k] = moduli(&seed, &lambda[k]);
            make_triangle(&seed, k % 5, X[k], y[k]);
            if (k == 7) memset(y[k], 0, sizeof y[k]);
            B[4] = clothi_rest_inverse(X[k], B);
            to_lane(y[k], 9, k, x);
            to_lane(B, 5, k, rest);
            rest[5 * LANES + k] = mu[k];
            rest[6 * LANES + k] = lambda[k];
        }
        clothi_stretch_squares(x, rest, E, Ed);
        for (k = 0; k < LANES; k++) {
            double s[2];
            cloth_stretch_state(y[k], X[k], 1, 1, NULL, NULL, NULL, s);
            CHECK_NEAR(E[k], s[1] * s[1], 1e-14 * (1 + s[0] * s[0]));
            CHECK_NEAR(Ed[k], s[0] * s[0], 1e-14 * (1 + s[0] * s[0]));
        }
        for (psd = 0; psd < 2; psd++) {
            clothi_stretch_lanes(x, rest, clothi_none, clothi_none, E, Ed, f);
            clothi_stretch_blocks(x, x, rest, clothi_none, clothi_none, psd, H);
            for (k = 0; k < LANES; k++) {
                double g[9], h[81], gl[9], hl[81];
                CHECK_REL(E[k], cloth_stretch(y[k], X[k], mu[k], lambda[k], g, h, psd), 1e-12);
                from_lane(f, 9, k, gl);
                full_hessian(H, 3, k, hl);
                CHECK(ref_difference(gl, g, 9) < 1e-12);
                CHECK(ref_difference(hl, h, 81) < 1e-12);
                if (psd) CHECK(ref_smallest_eigenvalue(hl, 9) > -1e-12);
            }
        }
    }
}

/* F = sum of x_i g_i', [3 x 2], and g_i [3 x 2] themselves: gradients of barycentric weights. */
static void deformation(const double *x, const double *X, double *g, double *F) {
    const double u[2] = {X[2] - X[0], X[3] - X[1]}, w[2] = {X[4] - X[0], X[5] - X[1]};
    const double det = u[0] * w[1] - u[1] * w[0];
    int          i, a, b;
    g[2] = w[1] / det, g[3] = -w[0] / det, g[4] = -u[1] / det, g[5] = u[0] / det;
    g[0] = -g[2] - g[4], g[1] = -g[3] - g[5];
    for (a = 0; a < 3; a++)
        for (b = 0; b < 2; b++)
            for (F[2 * a + b] = 0, i = 0; i < 3; i++) F[2 * a + b] += x[3 * i + a] * g[2 * i + b];
}

/* Newton's definite model from the iterate before, y0: of blocks i, j the geometric term has S of
 * E0 + 1/2 (F0'dF + dF'F0), the strain that y - y0 predicted, the rest is at y. So against the
 * Hessian at y it is, with E = 1/2 (F'F - I), off by A g_i'(S of that strain - S of E) g_j I. */
static void lanes_predicted(void) {
    unsigned long long seed = 21;
    int                round, i, j, k, a, b;
    for (round = 0; round < 20; round++) {
        double x[9 * LANES], x0[9 * LANES], rest[7 * LANES], H[27 * LANES], G[27 * LANES];
        double X[LANES][6], y[LANES][9], y0[LANES][9], mu[LANES], lambda[LANES];
        for (k = 0; k < LANES; k++) {
            double B[5];
            random_rest(&seed, X[k]);
            mu[k] = moduli(&seed, &lambda[k]);
            random_points(&seed, 9, 1, y[k]), random_points(&seed, 9, 1, y0[k]);
            B[4] = clothi_rest_inverse(X[k], B);
            to_lane(y[k], 9, k, x), to_lane(y0[k], 9, k, x0);
            to_lane(B, 5, k, rest);
            rest[5 * LANES + k] = mu[k], rest[6 * LANES + k] = lambda[k];
        }
        clothi_stretch_blocks(x, x, rest, clothi_none, clothi_none, 0, H);
        clothi_stretch_blocks(x, x0, rest, clothi_none, clothi_none, 0, G);
        for (k = 0; k < LANES; k++) {
            double g[6], F[6], F0[6], D[4], h[81], at_x[81], from[81], trace;
            deformation(y[k], X[k], g, F), deformation(y0[k], X[k], g, F0);
            for (a = 0; a < 4; a++)         /* predicted strain - E, of the linear part alone */
                for (D[a] = 0, i = 0; i < 6; i += 2) {
                    const double *f0 = F0 + i, *f = F + i;
                    const int     p = a / 2, q = a % 2;
                    D[a] += 0.5 * (f0[p] * f[q] + f[p] * f0[q] - f0[p] * f0[q] - f[p] * f[q]);
                }
            trace = D[0] + D[3];
            for (a = 0; a < 4; a++) D[a] = 2 * mu[k] * D[a] + (a % 3 ? 0 : lambda[k] * trace);
            full_hessian(H, 3, k, at_x), full_hessian(G, 3, k, from);
            memset(h, 0, sizeof h);
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++)
                    for (a = 0; a < 2; a++)
                        for (b = 0; b < 6; b++)
                            h[9 * (3 * i + b / 2) + 3 * j + b / 2] +=
                                rest[4 * LANES + k] * g[2 * i + a] * D[2 * a + b % 2] *
                                g[2 * j + b % 2];
            for (i = 0; i < 81; i++) h[i] += at_x[i];
            CHECK(ref_difference(from, h, 81) < 1e-12);
            CHECK(ref_difference(from, at_x, 81) > 1e-3);
        }
    }
}

/* kinds 0..7: random, folded, bent, flat, near degenerate, collapsed, no edge, one point */
static void make_lane_hinge(unsigned long long *seed, int kind, double *x) {
    double t[2], h[2], theta = ref_uniform(seed, -0.5, 0.5);
    t[0] = ref_uniform(seed, -0.5, 1.5);
    t[1] = ref_uniform(seed, -0.5, 1.5);
    h[0] = kind == 4 ? 1e-4 : ref_uniform(seed, 0.5, 1.5);
    h[1] = ref_uniform(seed, 0.5, 1.5);
    if (kind == 1) theta = theta > 0 ? 3.1 : -3.1;
    if (kind == 2) theta *= 5;
    if (kind == 3) theta *= 1e-9;
    make_hinge(kind == 3 ? NULL : seed, ref_uniform(seed, 0.5, 1.5), t, h, theta, x);
    if (kind == 0) random_points(seed, 12, 1, x);
    if (kind == 5) memcpy(x + 6, x, 3 * sizeof *x);
    if (kind == 6) memcpy(x + 3, x, 3 * sizeof *x);
    if (kind == 7) memset(x, 0, 12 * sizeof *x);
}

static void lanes_hinge(void) {
    unsigned long long seed = 11;
    int                round, k, psd;
    for (round = 0; round < 100; round++) {
        double x[12 * LANES], rest[2 * LANES], E[LANES], Ed[LANES], theta[LANES], f[12 * LANES];
        double H[54 * LANES], y[LANES][12];
        for (k = 0; k < LANES; k++) {
            make_lane_hinge(&seed, k, y[k]);
            to_lane(y[k], 12, k, x);
            rest[k] = ref_uniform(&seed, 0.1, 2);
            rest[LANES + k] = k == 3 ? 0.0 : ref_uniform(&seed, -1, 1);
            if (fabs(cloth_dihedral(y[k]) - rest[LANES + k]) > pi)
                rest[LANES + k] *= -1;      /* where the wrap of the lanes has nothing to do */
        }
        clothi_hinge_measure(x, rest, theta);
        clothi_hinge_lanes(x, rest, clothi_none, clothi_none, E, Ed, f);
        for (psd = 0; psd < 2; psd++) {
            clothi_hinge_blocks(x, x, rest, clothi_none, clothi_none, psd, H);
            for (k = 0; k < LANES; k++) {
                double       g[12], h[144], gl[12], hl[144];
                const double near = k == 4 ? 1e-10 : 1e-12;
                CHECK_REL(theta[k], cloth_dihedral(y[k]), near);
                CHECK_REL(E[k], cloth_bend(y[k], rest[k], rest[LANES + k], g, h, psd), near);
                from_lane(f, 12, k, gl);
                full_hessian(H, 4, k, hl);
                CHECK(ref_difference(gl, g, 12) < near);
                CHECK(ref_difference(hl, h, 144) < near);
                if (psd) CHECK(ref_smallest_eigenvalue(hl, 12) > -1e-12);
            }
        }
    }
}

/* Beyond half a turn from rest the lanes go the short way round: energy, force and Hessian against
 * differences of the wrapped reference, and no leap of the energy where theta leaps. */
static void lanes_hinge_wrapped(void) {
    static const double foot[2] = {0.4, 0.7}, height[2] = {1, 0.8};
    double              x[12 * LANES], rest[2 * LANES], E[LANES], Ed[LANES], theta[LANES];
    double              f[12 * LANES], H[54 * LANES], y[LANES][12];
    int                 k, i;
    for (k = 0; k < LANES; k++) {           /* 6 and 7: either side of the leap */
        const double at = k < 6 ? 1.5 + 0.25 * k : k == 6 ? pi - 1e-9 : pi + 1e-9;
        const double sign = k % 2 && k < 6 ? -1 : 1;
        make_hinge(NULL, 1.0, foot, height, sign * at, y[k]);
        to_lane(y[k], 12, k, x);
        rest[k] = 2;
        rest[LANES + k] = k < 6 ? -2.5 * sign : 2.5;
    }
    clothi_hinge_measure(x, rest, theta);
    clothi_hinge_lanes(x, rest, clothi_none, clothi_none, E, Ed, f);
    clothi_hinge_blocks(x, x, rest, clothi_none, clothi_none, 0, H);
    for (k = 0; k < 6; k++) {
        const ref_hinge h = {2, rest[LANES + k]};
        double          g[12], h12[144], gl[12], hl[144];
        ref_real        z[12];
        for (i = 0; i < 12; i++) z[i] = (ref_real)y[k][i];
        CHECK(fabs(theta[k] - h.theta0) > pi);
        CHECK_REL(E[k], (double)ref_hinge_wrapped(z, &h), 1e-12);
        ref_gradient(ref_hinge_wrapped, &h, y[k], 12, 2e-3, g);
        ref_hessian(ref_hinge_wrapped, &h, y[k], 12, 2e-3, h12);
        from_lane(f, 12, k, gl);
        full_hessian(H, 4, k, hl);
        CHECK(ref_difference(gl, g, 12) < 1e-8 && ref_difference(hl, h12, 144) < 1e-6);
    }
    CHECK(theta[6] > 3 && theta[7] < -3);
    CHECK_NEAR(E[7] - E[6], 4e-9 * (pi - 2.5), 1e-14);
}

static void lanes_quadratic(void) {
    unsigned long long seed = 12;
    int                round, k;
    for (round = 0; round < 50; round++) {
        double x[12 * LANES], rest[5 * LANES], E[LANES], Ed[LANES], f[12 * LANES], y[LANES][12];
        double w[LANES][4], H[54 * LANES];
        for (k = 0; k < LANES; k++) {
            double shape[12];
            random_points(&seed, 12, 1, shape);
            random_points(&seed, 12, 1, y[k]);
            cloth_bend_quadratic_weights(shape, w[k]);
            rest[k] = ref_uniform(&seed, 0.1, 2);
            to_lane(w[k], 4, k, rest + LANES);
            to_lane(y[k], 12, k, x);
        }
        clothi_quadratic_lanes(x, rest, clothi_none, clothi_none, E, Ed, f);
        clothi_quadratic_blocks(x, x, rest, clothi_none, clothi_none, 0, H);
        for (k = 0; k < LANES; k++) {
            double g[12], gl[12], h[144], hl[144];
            CHECK_REL(E[k], cloth_bend_quadratic(y[k], w[k], rest[k], g, h), 1e-12);
            from_lane(f, 12, k, gl);
            full_hessian(H, 4, k, hl);
            CHECK(ref_difference(gl, g, 12) < 1e-12);
            CHECK(ref_difference(hl, h, 144) < 1e-12);
        }
    }
}

static void lanes_spring(void) {
    unsigned long long seed = 13;
    int                round, k, psd;
    for (round = 0; round < 50; round++) {
        double x[6 * LANES], rest[2 * LANES], E[LANES], Ed[LANES], f[6 * LANES], H[9 * LANES];
        double y[LANES][6];
        for (k = 0; k < LANES; k++) {
            random_points(&seed, 6, 1, y[k]);
            if (k == 6) memcpy(y[k] + 3, y[k], 3 * sizeof(double));
            to_lane(y[k], 6, k, x);
            rest[k] = ref_uniform(&seed, 0.1, 2);
            rest[LANES + k] = k == 7 ? 0.0 : ref_uniform(&seed, 0.1, 2);
        }
        for (psd = 0; psd < 2; psd++) {
            clothi_spring_lanes(x, rest, clothi_none, clothi_none, E, Ed, f);
            clothi_spring_blocks(x, x, rest, clothi_none, clothi_none, psd, H);
            for (k = 0; k < LANES; k++) {
                double g[6], h[36], gl[6], hl[36];
                CHECK_REL(E[k], cloth_spring(y[k], rest[LANES + k], rest[k], g, h, psd), 1e-12);
                from_lane(f, 6, k, gl);
                full_hessian(H, 2, k, hl);
                CHECK(ref_difference(gl, g, 6) < 1e-12);
                CHECK(ref_difference(hl, h, 36) < 1e-12);
            }
        }
    }
}

/* One element in all lanes, with what it starts from, as the functions of its kind see it. */
typedef struct one {
    const clothi_kind *kind;
    double             rest[7], start[12], damp;        /* start: positions */
} one;

static int numbers(const one *d) { return 3 * d->kind->corners; }

static void one_rest(const one *d, double *rest, double *start, double *damp) {
    double x[12 * LANES];
    int    k;
    for (k = 0; k < LANES; k++) {
        to_lane(d->rest, d->kind->nrest, k, rest);
        to_lane(d->start, numbers(d), k, x);
        damp[k] = d->damp;
    }
    d->kind->measure(x, rest, start);
}

/* Elastic plus dissipated energy. */
static double one_energy(const double *y, const one *d, double *g, double *full, int psd) {
    double x[12 * LANES], rest[7 * LANES], start[3 * LANES], damp[LANES], E[LANES], Ed[LANES];
    double f[12 * LANES], H[54 * LANES];
    int    k;
    one_rest(d, rest, start, damp);
    for (k = 0; k < LANES; k++) to_lane(y, numbers(d), k, x);
    d->kind->lanes(x, rest, start, damp, E, Ed, f);
    if (g) from_lane(f, numbers(d), 5, g);
    if (full) {
        d->kind->blocks(x, x, rest, start, damp, psd, H);
        full_hessian(H, d->kind->corners, 5, full);
    }
    return E[5] + Ed[5];
}

/* An element of a kind, near x and away from rest. */
static void make_one(unsigned long long *seed, int kind, int round, one *d, double *x) {
    memset(d, 0, sizeof *d);
    d->kind = clothi_kinds + kind;
    d->damp = ref_uniform(seed, 0.1, 3);
    d->rest[0] = 1.3;
    if (kind == CLOTHI_TRIANGLE) {
        double X[6];
        random_rest(seed, X);
        make_triangle(seed, round % 3, X, x);
        d->rest[4] = clothi_rest_inverse(X, d->rest);
        d->rest[5] = moduli(seed, &d->rest[6]);
    } else if (kind == CLOTHI_SPRING) {
        random_points(seed, 6, 1, x);
        d->rest[1] = round % 2 ? 0.2 : 3;
    } else {
        make_lane_hinge(seed, round % 3 ? 2 : 0, x);
        d->rest[1] = 0.2;
        if (kind == CLOTHI_QUADRATIC) {
            double shape[12];
            make_lane_hinge(seed, 0, shape);
            cloth_bend_quadratic_weights(shape, d->rest + 1);
        }
    }
    memcpy(d->start, x, sizeof d->start);
}

static void lanes_damping(void) {
    unsigned long long seed = 14;
    int                round, i, j;
    for (round = 0; round < 80; round++) {
        const int kind = round % 4;
        one    d;
        double x[12] = {0}, y[12], g[12], H[144], up[12], down[12], gr[12], Hr[144], R[9];
        double shift[3] = {0, 0, 0};
        int    n;
        make_one(&seed, kind, round / 4, &d, x);
        n = numbers(&d);
        memcpy(y, x, sizeof y);             /* a rigid motion since the step's start: no loss */
        ref_rotation(&seed, R);
        if (kind != CLOTHI_QUADRATIC) {     /* whose damping is not blind to rotations */
            random_points(&seed, 3, 1, shift);
            ref_move(R, shift, d.kind->corners, y);
        }
        one_energy(y, &d, g, NULL, 0);
        {
            one free = d;
            free.damp = 0;
            CHECK_REL(one_energy(y, &d, NULL, NULL, 0), one_energy(y, &free, gr, NULL, 0), 1e-12);
            CHECK(ref_difference(g, gr, n) < 1e-11);
        }
        for (i = 0; i < n; i++) y[i] += ref_uniform(&seed, -0.05, 0.05);
        one_energy(y, &d, g, H, 0);
        for (i = 0; i < n; i++) {           /* Hessian against differences of the gradient */
            const double h = 1e-5, at = y[i];
            double       a, b;
            y[i] = at + h;
            a = one_energy(y, &d, up, NULL, 0);
            y[i] = at - h;
            b = one_energy(y, &d, down, NULL, 0);
            y[i] = at;
            gr[i] = (a - b) / (2 * h);
            for (j = 0; j < n; j++) Hr[n * j + i] = (up[j] - down[j]) / (2 * h);
        }
        CHECK(ref_difference(g, gr, n) < 1e-6);
        CHECK(ref_difference(H, Hr, n * n) < 1e-6);
        one_energy(y, &d, g, H, 1);
        CHECK(ref_smallest_eigenvalue(H, n) > -1e-12);
    }
}

/* a.f of one element. */
static double one_pull(const double *y, const one *d, const double *a) {
    double g[12], sum = 0;
    int    i;
    one_energy(y, d, g, NULL, 0);
    for (i = 0; i < numbers(d); i++) sum += a[i] * g[i];
    return sum;
}

/* dV of the element d by *at, a number of it, by differences. */
static double one_slope(const double *y, one *d, const double *a, double *at) {
    const double h = 1e-5, was = *at;
    double       up, down;
    *at = was + h;
    up = one_pull(y, d, a);
    *at = was - h;
    down = one_pull(y, d, a);
    *at = was;
    return (up - down) / (2 * h);
}

/* Hessian times vector against the blocks, and what V = a.f does when rest, damping and start
 * change against differences; the triangle's rest corners are left to tests/test_terms.c. */
static void lanes_products(void) {
    unsigned long long seed = 16;
    int                round, i, k;
    for (round = 0; round < 80; round++) {
        one    d;
        double y[12], u[12], H[144], Hu[12] = {0}, got[12], want[12], y8[12 * LANES];
        double u8[12 * LANES], n8[12 * LANES], rest[7 * LANES], start[3 * LANES], damp[LANES];
        double d_rest[7 * LANES], d_damp[LANES], d_x_n[12 * LANES], Ha[12 * LANES];
        double undamped[7 * LANES];
        int    n;
        memset(y, 0, sizeof y);
        make_one(&seed, round % 4, round / 4, &d, y);
        n = numbers(&d);
        for (i = 0; i < n; i++) d.start[i] += ref_uniform(&seed, -0.05, 0.05);
        random_points(&seed, 12, 1, u);
        one_energy(y, &d, NULL, H, 0);
        for (i = 0; i < n * n; i++) Hu[i / n] += H[i] * u[i % n];
        one_rest(&d, rest, start, damp);
        for (k = 0; k < LANES; k++) {
            to_lane(y, n, k, y8);
            to_lane(u, n, k, u8);
            to_lane(d.start, n, k, n8);
        }
        d.kind->vjp(y8, n8, u8, rest, damp, d_rest, d_damp, d_x_n, Ha);
        from_lane(Ha, n, 5, got);
        CHECK(ref_difference(got, Hu, n) < 1e-12);
        from_lane(d_x_n, n, 5, got);
        for (i = 0; i < n; i++) want[i] = one_slope(y, &d, u, d.start + i);
        CHECK(ref_difference(got, want, n) < 1e-7);
        CHECK_REL(d_damp[5], one_slope(y, &d, u, &d.damp), 1e-7);
        for (i = round % 4 == CLOTHI_TRIANGLE ? 5 : 0; i < d.kind->nrest; i++) {
            const int    w = round % 4 == CLOTHI_QUADRATIC && i > 0;    /* their sum stays 0 */
            const double back = w ? one_slope(y, &d, u, d.rest + 1) : 0;
            CHECK_REL(d_rest[i * LANES + 5] - (w ? d_rest[LANES + 5] : 0) + 1,
                      one_slope(y, &d, u, d.rest + i) - back + 1, 1e-6);
        }
        for (k = 0; k < LANES; k++) damp[k] = 0;
        d.kind->vjp(y8, n8, u8, rest, damp, d_rest, d_damp, d_x_n, Ha);
        d.kind->vjp(y8, y8, u8, rest, damp, undamped, d_damp, d_x_n, Ha);
        CHECK(ref_difference(undamped, d_rest, d.kind->nrest * LANES) < 1e-14);
    }
}

static void lanes_gather(void) {
    unsigned long long seed = 15;
    double             x[3 * 20], out[12 * LANES], f[3 * 20], forces[12 * LANES];
    int                index[4 * LANES], start[21], entry[4 * LANES], i, k, n = 0, v;
    random_points(&seed, 60, 1, x);
    for (i = 0; i < 4 * LANES; i++) index[i] = (int)(ref_next(&seed) % 20);
    clothi_gather_lanes(x, index, 4, out);
    for (i = 0; i < 4; i++)
        for (k = 0; k < LANES; k++) {
            const double *p = x + 3 * index[LANES * i + k], *q = out + 3 * LANES * i + k;
            CHECK(!memcmp(p, q, sizeof *p) && !memcmp(p + 1, q + LANES, sizeof *p)
                  && !memcmp(p + 2, q + 2 * LANES, sizeof *p));
        }
    random_points(&seed, 12 * LANES, 1, forces);
    for (v = 0; v < 20; v++) {
        start[v] = n;
        for (i = 0; i < 4 * LANES; i++)
            if (index[i] == v) entry[n++] = 3 * LANES * (i / LANES) + i % LANES;
    }
    start[20] = n;
    clothi_sum_corners(forces, start, start + 1, entry, 0, 20, -1.0, f);
    for (v = 0; v < 20; v++)
        for (k = 0; k < 3; k++) {
            double sum = 0;
            for (i = 0; i < 4 * LANES; i++)
                if (index[i] == v) sum += forces[(3 * (i / LANES) + k) * LANES + i % LANES];
            CHECK_NEAR(f[3 * v + k], -sum, 0.0);
        }
}

/* ---- materials ------------------------------------------------------------------------------ */

static char logged[256];

static void keep_log(cloth_log_level level, cloth_status status, const char *text, void *user) {
    (void)level;
    (void)status;
    (void)user;
    strncpy(logged, text, sizeof logged - 1);
}

static void material_values(void) {
    cloth_material m = cloth_material_default();
    double         mu, lambda;
    int            i;
    m.young = 2e6;
    m.thickness = 1e-3;
    m.poisson = 0.25;
    cloth_material_lame(&m, &mu, &lambda);
    CHECK_REL(mu, 800.0, 1e-14);
    CHECK_REL(lambda, 2000 * 0.25 / 0.9375, 1e-14);
    m.plane = CLOTH_PLANE_STRAIN_3D;
    cloth_material_lame(&m, &mu, &lambda);
    CHECK_REL(lambda, 2000 * 0.25 / (1.25 * 0.5), 1e-14);
    CHECK_REL(cloth_material_rigidity(&m), 1e-5, 0.0);
    m.bending = -1;
    CHECK_REL(cloth_material_rigidity(&m), 2e6 * 1e-9 / (12 * 0.9375), 1e-14);
    m.membrane = 50;
    cloth_material_lame(&m, &mu, &lambda);
    CHECK_REL(mu, 20.0, 1e-14);
    m = cloth_material_li2021();
    cloth_material_lame(&m, &mu, &lambda);
    CHECK_REL(mu, 4 * 1e5 / (2 * 1.42), 1e-14);
    CHECK_REL(lambda, 4 * 1e5 * 0.42 / (1.42 * 0.16), 1e-14);
    CHECK_REL(cloth_material_rigidity(&m), 1.5e-6, 0.0);
    for (i = -1; i < 7; i++) {
        m = cloth_material_fabric((cloth_fabric)(i < 0 || i > 5 ? 99 : i));
        CHECK(cloth_material_check(NULL, &m, 0) == CLOTH_OK);
        CHECK(m.density > 0.05 && m.density < 0.4 && m.bending > 1e-6 && m.bending < 1e-4);
        cloth_material_lame(&m, &mu, &lambda);
        CHECK(mu > 50 && mu < 2000);
    }
}

static void material_refusals(void) {
    static const char *const field[8] = {"density", "young",   "thickness", "membrane",
                                         "poisson", "bending", "damping",   "plane"};
    static const double      bad[8] = {0.0, -1.0, -1.0, -1.0, 0.51, (double)NAN, -1.0, 0.0};
    cloth_hooks              hooks;
    cloth_material           m;
    int                      i, kind;
    memset(&hooks, 0, sizeof hooks);
    hooks.log.fn = keep_log;
    for (i = 0; i < 8; i++)
        for (kind = 0; kind < 3; kind++) {
            double *const value[7] = {&m.density, &m.young,   &m.thickness, &m.membrane,
                                      &m.poisson, &m.bending, &m.damping};
            cloth_status  status, expect = CLOTH_ERR_NONFINITE;
            m = cloth_material_default();
            if (i == 7) m.plane = (cloth_plane)2;
            else *value[i] = kind == 0 ? bad[i] : kind == 1 ? (double)NAN : -(double)INFINITY;
            if (i == 7 || (kind == 0 && i != 5)) expect = CLOTH_ERR_ARGUMENT;
            logged[0] = 0;
            status = cloth_material_check(&hooks, &m, 3);
            CHECK(status == expect);
            CHECK(strstr(logged, "material[3].") == logged && strstr(logged, field[i]) != NULL);
        }
    CHECK(cloth_material_check(&hooks, NULL, 0) == CLOTH_ERR_ARGUMENT);
    CHECK(strstr(logged, "is NULL") != NULL);
    m = cloth_material_default();
    m.poisson = 0.5;
    CHECK(cloth_material_check(&hooks, &m, 0) == CLOTH_OK);
    m.plane = CLOTH_PLANE_STRAIN_3D;
    CHECK(cloth_material_check(&hooks, &m, 0) == CLOTH_ERR_ARGUMENT);
    m.poisson = -1;
    CHECK(cloth_material_check(&hooks, &m, 0) == CLOTH_ERR_ARGUMENT);
    CHECK(strstr(logged, "poisson = -1") != NULL);
    m = cloth_material_default();
    m.young = m.thickness = 1e200;
    CHECK(cloth_material_check(&hooks, &m, 0) == CLOTH_ERR_ARGUMENT);
}

/* Pull a strip: the force gives Y back, the free sides nu. Only plane stress does. */
static void material_uniaxial(void) {
    static const double X[6] = {0, 0, 1, 0, 0, 1};
    cloth_material      m = cloth_material_default();
    double              mu, lambda, x[9] = {0}, g[9], l = 1.0 + 1e-4, side = 1.0;
    int                 k;
    m.membrane = 123;
    m.poisson = 0.35;
    cloth_material_lame(&m, &mu, &lambda);
    for (k = 0; k < 60; k++) {              /* relax the side by its force */
        x[3] = l;
        x[7] = side;
        cloth_stretch(x, X, mu, lambda, g, NULL, 0);
        side -= g[7] / (0.5 * (2 * mu + lambda));
    }
    CHECK_REL(g[3] / 0.5 / (l - 1), 123, 1e-3);
    CHECK_REL((1 - side) / (l - 1), 0.35, 1e-3);
}

/* ---- any finite bits ------------------------------------------------------------------------ */

static double any_finite(unsigned long long *seed) {
    double a;
    switch (ref_next(seed) % 8) {
    case 0: return 0.0;
    case 1: return ref_uniform(seed, -1, 1);
    case 2: return (double)(ref_next(seed) % 3);
    case 3: return ref_uniform(seed, -1, 1) * 1e-200;
    case 4: return ref_uniform(seed, -1, 1) * 1e200;
    default:
        do {
            unsigned long long bits = ref_next(seed);
            memcpy(&a, &bits, sizeof a);
        } while (!clothi_finite(a));
        return a;
    }
}

static void finite_in_finite_out(void) {
    unsigned long long seed = 9;
    const int          rounds = test_full() ? 3000000 : 30000;
    int                k, i, psd;
    for (k = 0; k < rounds; k++) {
        double v[24], g[12], H[144], F[6], E[4], S[4], st[2], w[4];
        int    bad = 0;
        for (i = 0; i < 24; i++) v[i] = any_finite(&seed);
        if (k % 3 == 0)                     /* copies of corners: collapsed shapes of any size */
            for (i = 1; i < 4; i++)
                if (ref_next(&seed) % 2) memcpy(v + 3 * i, v, 3 * sizeof *v);
        for (psd = 0; psd < 2; psd++) {
            bad |= !clothi_finite(cloth_spring(v, fabs(v[12]), fabs(v[13]), g, H, psd));
            bad |= clothi_find_nonfinite(g, 6) >= 0 || clothi_find_nonfinite(H, 36) >= 0;
            bad |= !clothi_finite(cloth_stretch(v, v + 12, v[18], v[19], g, H, psd));
            bad |= clothi_find_nonfinite(g, 9) >= 0 || clothi_find_nonfinite(H, 81) >= 0;
            bad |= !clothi_finite(cloth_bend(v, v[12], v[13], g, H, psd));
            bad |= clothi_find_nonfinite(g, 12) >= 0 || clothi_find_nonfinite(H, 144) >= 0;
        }
        bad |= !clothi_finite(cloth_dihedral_hess(v, g, H));
        bad |= clothi_find_nonfinite(g, 12) >= 0 || clothi_find_nonfinite(H, 144) >= 0;
        bad |= !clothi_finite(cloth_stretch_state(v, v + 12, v[18], v[19], F, E, S, st));
        bad |= clothi_find_nonfinite(F, 6) >= 0 || clothi_find_nonfinite(E, 4) >= 0;
        bad |= clothi_find_nonfinite(S, 4) >= 0 || clothi_find_nonfinite(st, 2) >= 0;
        cloth_bend_quadratic_weights(v, w);
        bad |= clothi_find_nonfinite(w, 4) >= 0;
        bad |= !clothi_finite(cloth_bend_quadratic(v, v + 12, v[16], g, H));
        bad |= clothi_find_nonfinite(g, 12) >= 0 || clothi_find_nonfinite(H, 144) >= 0;
        bad |= !clothi_finite(cloth_hinge_coefficient(v[0], v[1], v[2], v[3]));
        if (!CHECK(!bad)) break;
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(spring_derivatives);
    RUN(spring_degenerate);
    RUN(stretch_derivatives);
    RUN(stretch_psd);
    RUN(stretch_closed_forms);
    RUN(stretch_table);
    RUN(stretch_invariance);
    RUN(stretch_degenerate);
    RUN(hinge_derivatives);
    RUN(hinge_near_degenerate);
    RUN(hinge_sign);
    RUN(hinge_cylinder);
    RUN(hinge_invariance);
    RUN(hinge_degenerate);
    RUN(quadratic_is_the_flat_hinge);
    RUN(lanes_stretch);
    RUN(lanes_predicted);
    RUN(lanes_hinge);
    RUN(lanes_hinge_wrapped);
    RUN(lanes_quadratic);
    RUN(lanes_spring);
    RUN(lanes_damping);
    RUN(lanes_products);
    RUN(lanes_gather);
    RUN(material_values);
    RUN(material_refusals);
    RUN(material_uniaxial);
    RUN(finite_in_finite_out);
    return TEST_END();
}
