/* patch.c - irregular meshes must hold every uniform deformation exactly.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. validate/patch.c -lm
 *
 * A jittered unit square with slivers of 2 degrees; its boundary is held at x = F X for ten F
 * [3 x 2], its interior starts displaced: the static solution is x = F X. Bending makes the flat
 * sheet stable under compression; it does not enter the solution. Then the same with the rest
 * triangles turned in their planes, with vertices and faces in another order, and mirrored. */
#include "statics.h"

#define N 9                                 /* vertices along a side                           */

typedef struct patch_result { double worst, uneven, residual, energy; } patch_result;

/* In radians; negative when a triangle is upside down. */
static double smallest_angle(const cloth_mesh *mesh) {
    double least = 4;
    int    f, k, c;
    for (f = 0; f < mesh->nf; f++)
        for (k = 0; k < 3; k++) {
            const double *p = mesh->x + 3 * mesh->faces[3 * f + k];
            const double *q = mesh->x + 3 * mesh->faces[3 * f + (k + 1) % 3];
            const double *r = mesh->x + 3 * mesh->faces[3 * f + (k + 2) % 3];
            double        u[2], v[2];
            for (c = 0; c < 2; c++) {
                u[c] = q[2 * c] - p[2 * c];
                v[c] = r[2 * c] - p[2 * c];
            }
            least = fmin(least, atan2(u[1] * v[0] - u[0] * v[1], u[0] * v[0] + u[1] * v[1]));
        }
    return least;
}

/* Makes the first face around the vertex that can be one a sliver: the vertex goes to 0.035 of the
 * opposite edge from a third of it. */
static int make_sliver(cloth_mesh *mesh, int vertex) {
    double *p = mesh->x + 3 * vertex, old[3];
    int     f, k;
    memcpy(old, p, sizeof old);
    for (f = 0; f < mesh->nf; f++) {
        const int    *t = mesh->faces + 3 * f;
        const double *a, *b;
        for (k = 0; k < 3 && t[k] != vertex; k++) {}
        if (k == 3) continue;
        a = mesh->x + 3 * t[(k + 1) % 3];
        b = mesh->x + 3 * t[(k + 2) % 3];
        p[0] = (2 * a[0] + b[0]) / 3 + 0.024 * (b[2] - a[2]);
        p[2] = (2 * a[2] + b[2]) / 3 - 0.024 * (b[0] - a[0]);
        if (smallest_angle(mesh) > 0.03) return 1;
        memcpy(p, old, sizeof old);
    }
    return 0;
}

/* Interior vertices jittered by 0.3 of an edge, and three slivers. */
static cloth_mesh *jittered(unsigned long long *seed) {
    cloth_mesh  *mesh = NULL;
    const double l = 1.0 / (N - 1);
    int          i, k, slivers = 0;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, 1, 1, &mesh) == CLOTH_OK);
    for (i = 0; i < N * N; i++)
        if (i % N > 0 && i % N < N - 1 && i / N > 0 && i / N < N - 1)
            for (k = 0; k < 3; k += 2) mesh->x[3 * i + k] += ref_uniform(seed, -0.3, 0.3) * l;
    CHECK(smallest_angle(mesh) > 0);
    for (i = N + 1; i < N * N && slivers < 3; i++)
        if (i % N > 0 && i % N < N - 1 && make_sliver(mesh, i)) {
            slivers++;
            i += N;
        }
    CHECK(slivers == 3);
    return mesh;
}

/* Ten gradients [3 x 2] over (X, Z) of the sheet. */
static void gradient(int which, double *F) {
    static const double axis[3] = {0.48, 0.6, 0.64};
    static const double flat[10][4] = {
        {1, 0, 0, 1},       {1, 0, 0, 1},    {1, 0, 0, 1},       {1, 0, 0, 1},
        {1.3, 0, 0, 0.9},   {1, 0.4, 0, 1},  {1.2, 0.1, 0, 0.95}, {1.1, 0, 0, 1.1},
        {0.97, 0, 0, 0.96}, {1.4, 0.3, -0.2, 1.15},
    };
    static const double turn[10] = {0, 17, 90, 179, 0, 0, 60, 0, 33, 140};
    const double        pi = 3.14159265358979323846, a = turn[which] * pi / 180;
    double              R[9];
    int                 i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            const int m = 3 - i - j;
            R[3 * i + j] = (1 - cos(a)) * axis[i] * axis[j] + (i == j ? cos(a) : 0);
            if (i != j) R[3 * i + j] += ((j - i + 3) % 3 == 1 ? -1 : 1) * sin(a) * axis[m];
        }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 2; j++)
            for (F[2 * i + j] = 0, k = 0; k < 2; k++)
                F[2 * i + j] += R[3 * i + 2 * k] * flat[which][2 * k + j];
}

/* Energy of the unit square under F, Y = 1, nu = 0.3. */
static double closed_form(const double *F) {
    const double mu = 1 / 2.6, lambda = 0.3 / 0.91;
    double       E[3] = {-0.5, 0, -0.5};
    int          i;
    for (i = 0; i < 3; i++) {
        E[0] += 0.5 * F[2 * i] * F[2 * i];
        E[1] += 0.5 * F[2 * i] * F[2 * i + 1];
        E[2] += 0.5 * F[2 * i + 1] * F[2 * i + 1];
    }
    return mu * (E[0] * E[0] + 2 * E[1] * E[1] + E[2] * E[2])
           + 0.5 * lambda * (E[0] + E[2]) * (E[0] + E[2]);
}

static int at_boundary(const double *x) {
    return !(x[0] > 1e-9 && x[0] < 1 - 1e-9 && x[2] > 1e-9 && x[2] < 1 - 1e-9);
}

/* Energies per area of all faces: how far the largest is from the smallest. */
static double unevenness(const scene *s, const double *x, double size) {
    const cloth_params *p = cloth_sim_params(s->sim);
    double              low = 1e300, high = -1e300;
    int                 f, k;
    for (f = 0; f < s->mesh->nf; f++) {
        double corner[9], w, F[6], E[4], S[4], stretches[2], area;
        const double *X = p->X + 6 * f;
        for (k = 0; k < 3; k++)
            memcpy(corner + 3 * k, x + 3 * s->mesh->faces[3 * f + k], 3 * sizeof *x);
        area = cloth_stretch_state(corner, X, 0.4, 0.3, F, E, S, stretches);
        w = cloth_stretch(corner, X, 0.4, 0.3, NULL, NULL, 0) / area;
        low = fmin(low, w);
        high = fmax(high, w);
    }
    return (high - low) / size;
}

/* Solves the patch; X: rest corners, or NULL. */
static int solve(cloth_mesh *mesh, const double *X, const double *F, unsigned long long *seed,
                 patch_result *out) {
    double *start = (double *)malloc(3 * (size_t)mesh->nv * sizeof *start), *grad, *exact;
    scene   s;
    int     i, k, good;
    grad = (double *)malloc(3 * (size_t)mesh->nv * sizeof *grad);
    exact = (double *)malloc(3 * (size_t)mesh->nv * sizeof *exact);
    memset(out, 0, sizeof *out);
    scene_begin(&s, mesh);
    scene_material(&s, 1, 1, 0.3, 0.05);
    s.desc.X = X;
    s.desc.x = start;
    s.desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
    for (i = 0; i < mesh->nv; i++) {
        const double *p = mesh->x + 3 * i;
        for (k = 0; k < 3; k++) {
            exact[3 * i + k] = F[2 * k] * p[0] + F[2 * k + 1] * p[2];
            start[3 * i + k] = exact[3 * i + k];
            if (!at_boundary(p)) start[3 * i + k] += ref_uniform(seed, -0.001, 0.001);
        }
        if (at_boundary(p)) scene_pin(&s, i, CLOTH_AXIS_ALL);
    }
    good = scene_start(&s) && scene_solve(&s);
    if (good) {
        const double *x = scene_x(&s);
        CHECK(cloth_sim_potential(s.sim, x, &out->energy, grad) == CLOTH_OK);
        for (i = 0; i < 3 * mesh->nv; i++) {
            out->worst = fmax(out->worst, fabs(x[i] - exact[i]));
            if (!at_boundary(mesh->x + 3 * (i / 3)))
                out->residual = fmax(out->residual, fabs(grad[i]));
        }
        out->uneven = unevenness(&s, x, fmax(out->energy, 1e-3));
    }
    s.mesh = NULL;                          /* the caller's                                    */
    scene_end(&s);
    free(start);
    free(grad);
    free(exact);
    return good;
}

static void ten_gradients(void) {
    unsigned long long seed = 5;
    cloth_mesh        *mesh = jittered(&seed);
    int                k;
    CHECK(smallest_angle(mesh) > 0.01);
    printf("  smallest angle %.2f degrees\n", smallest_angle(mesh) * 57.29577951308232);
    printf("  F    energy        |x - F X|  energy uneven  interior force\n");
    for (k = 0; k < 10; k++) {
        patch_result r;
        double       F[6];
        gradient(k, F);
        if (!solve(mesh, NULL, F, &seed, &r)) continue;
        printf("  %d  %.9f    %8.1e       %8.1e        %8.1e\n", k, r.energy, r.worst, r.uneven,
               r.residual);
        CHECK_NEAR(r.energy, closed_form(F), 1e-14);
        CHECK(r.worst <= 1e-10);
        CHECK(r.uneven <= 1e-11);
        CHECK(r.residual <= 5e-12);       /* hinges of slivers: D eps over their height */
    }
    cloth_mesh_destroy(NULL, mesh);
}

/* Corners of each face turned by its own angle in the plane: the same energy and solution. */
static void turned_rest_triangles(void) {
    unsigned long long seed = 6;
    cloth_mesh        *mesh = jittered(&seed);
    double             F[6], *X = (double *)malloc(6 * (size_t)mesh->nf * sizeof *X);
    patch_result       plain, turned;
    int                f, k;
    CHECK(cloth_flatten(mesh->nv, mesh->x, mesh->nf, mesh->faces, X) == CLOTH_OK);
    for (f = 0; f < mesh->nf; f++) {
        const double a = ref_uniform(&seed, -3, 3), dx = ref_uniform(&seed, -2, 2);
        for (k = 0; k < 3; k++) {
            double *p = X + 6 * f + 2 * k, x = p[0], y = p[1];
            p[0] = cos(a) * x - sin(a) * y + dx;
            p[1] = sin(a) * x + cos(a) * y - dx;
        }
    }
    gradient(9, F);
    if (solve(mesh, NULL, F, &seed, &plain) && solve(mesh, X, F, &seed, &turned)) {
        printf("  rest triangles turned: energy differs by %.1e, |x - F X| %.1e\n",
               turned.energy / plain.energy - 1, turned.worst);
        CHECK_REL(turned.energy, plain.energy, 1e-13);
        CHECK(turned.worst <= 1e-10);
    }
    X[6 * 7] = -X[6 * 7];                   /* one face, then all, as seen in a mirror         */
    X[6 * 7 + 2] = -X[6 * 7 + 2];
    X[6 * 7 + 4] = -X[6 * 7 + 4];
    for (k = 0; k < 2; k++) {
        cloth_desc   d = cloth_desc_default();
        cloth_model *model = (cloth_model *)mesh;
        d.nv = mesh->nv;
        d.nf = mesh->nf;
        d.x_rest = mesh->x;
        d.faces = mesh->faces;
        d.X = X;
        CHECK(cloth_model_create(&d, &model) == CLOTH_ERR_MESH && model == NULL);
        for (f = 0; f < 3 * mesh->nf; f++)
            if (f / 3 != 7) X[2 * f] = -X[2 * f];
    }
    free(X);
    cloth_mesh_destroy(NULL, mesh);
}

/* Vertices, faces and first corners in another order. */
static void another_order(void) {
    unsigned long long seed = 7, one = 8;
    cloth_mesh        *mesh = jittered(&seed), *other = jittered(&one);
    int                i, k, *to = (int *)malloc((size_t)mesh->nv * sizeof *to);
    double             F[6];
    patch_result       a, b;
    for (i = 0; i < mesh->nv; i++) {
        const int j = (int)(ref_next(&seed) % (unsigned)(i + 1));
        to[i] = to[j];
        to[j] = i;
    }
    for (i = 0; i < mesh->nv; i++)
        memcpy(other->x + 3 * to[i], mesh->x + 3 * i, 3 * sizeof *mesh->x);
    for (i = 0; i < mesh->nf; i++)
        for (k = 0; k < 3; k++)
            other->faces[3 * ((37 * i + 11) % mesh->nf) + (k + i) % 3] =
                to[mesh->faces[3 * i + k]];
    gradient(6, F);
    if (solve(mesh, NULL, F, &seed, &a) && solve(other, NULL, F, &seed, &b)) {
        printf("  in another order: energy differs by %.1e, |x - F X| %.1e\n",
               b.energy / a.energy - 1, b.worst);
        CHECK_REL(a.energy, b.energy, 1e-13);
        CHECK(b.worst <= 1e-10);
    }
    free(to);
    cloth_mesh_destroy(NULL, mesh);
    cloth_mesh_destroy(NULL, other);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(ten_gradients);
    RUN(turned_rest_triangles);
    RUN(another_order);
    return TEST_END();
}
