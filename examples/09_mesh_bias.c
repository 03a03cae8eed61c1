/* 09_mesh_bias.c - the bending rigidity that a hinge sheet really has, by direction, for the three
 * patterns of cloth_mesh_sheet.
 *
 * Roll the sheet into a cylinder of small curvature k about each direction and compare the hinges'
 * energy with the plate's, D k^2/2 per area. Only equilateral triangles give D in every direction;
 * a grid with one diagonal is up to 3 times too stiff (bent along the diagonals, 135 degrees) and
 * a quarter too soft at 15 degrees from an axis. Refining changes nothing, for only directions
 * enter: section [6.3]. Why it matters: wrinkles run where bending is cheap.
 *
 * Notice: cloth_topology_create (hinges are ready for cloth_bend), cloth_hinge_coefficient.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 09_mesh_bias.c -lm
 *   page: out/09_mesh_bias.svg
 *   expected: at worst: equilateral 1.000 D, alternating 1.500 D, one diagonal 3.000 D
 *
 * Exercises: (1) EDGE 0.01: a mesh ten times finer, and the same numbers. (2) CURVATURE 5: an edge
 * spans half a radian, and the worst cases fall to 1.47 D and 2.91 D: the ratios are limits. (3) c
 * from twice the rigidity: nothing but the scale moves. No choice of c makes the orange curve flat.
 */
#include "clothsim.h"
#include "plot.h"

#define NX        12                /* vertices along x                                     */
#define EDGE      0.1               /* m                                                    */
#define CURVATURE 1e-4              /* 1/m                                                  */
#define RIGIDITY  1e-5              /* N m                                                  */

/* A cylinder of curvature k: s, the distance along the direction `angle` from x towards -z, becomes
 * (sin ks/k, (1 - cos ks)/k), the second without the difference of two nearly equal numbers. */
static void roll(const double *flat, int nv, double angle, double *x) {
    int i;
    for (i = 0; i < nv; i++) {
        const double s = flat[3 * i] * cos(angle) - flat[3 * i + 2] * sin(angle);
        const double ds = sin(CURVATURE * s) / CURVATURE - s;
        x[3 * i] = flat[3 * i] + ds * cos(angle);
        x[3 * i + 1] = 2.0 / CURVATURE * pow(sin(0.5 * CURVATURE * s), 2);
        x[3 * i + 2] = flat[3 * i + 2] - ds * sin(angle);
    }
}

static double area_of(const cloth_mesh *m, int face) {
    const double *X = m->X + 6 * face;
    return 0.5 * fabs((X[2] - X[0]) * (X[5] - X[1]) - (X[4] - X[0]) * (X[3] - X[1]));
}

/* 1 when the face lies in a window of whole periods in the middle (4 edges by 4 rows): there the
 * kinds of triangle stand in their true proportion. */
static int inside(const cloth_mesh *m, int face, double row) {
    const double *a = m->X + 6 * face;
    const double  x = (a[0] + a[2] + a[4]) / 3 / EDGE, z = -(a[1] + a[3] + a[5]) / 3 / row;
    return x > 3.2 && x < 7.2 && z > 4 && z < 8;
}

/* Energy of the hinges over that of the plate, on the window. A hinge's energy is shared by its
 * two faces in proportion to their areas. */
static double ratio(const cloth_mesh *m, const cloth_topology *t, double row, double angle,
                    double *x) {
    double energy = 0, area = 0;
    int    f, h, i, k;
    roll(m->x, m->nv, angle, x);
    for (f = 0; f < m->nf; f++)
        if (inside(m, f, row)) area += area_of(m, f);
    for (h = 0; h < t->nh; h++) {
        const int   *v = t->hinges + 4 * h, *faces = t->hinge_faces + 2 * h;
        const double A[2] = {area_of(m, faces[0]), area_of(m, faces[1])};
        double       p[12], e2 = 0, c;
        for (k = 0; k < 3; k++) e2 += pow(m->x[3 * v[1] + k] - m->x[3 * v[0] + k], 2);
        for (i = 0; i < 12; i++) p[i] = x[3 * v[i / 3] + i % 3];
        c = cloth_hinge_coefficient(RIGIDITY, e2, A[0], A[1]);
        for (i = 0; i < 2; i++)
            if (inside(m, faces[i], row))
                energy += cloth_bend(p, c, 0, NULL, NULL, 0) * A[i] / (A[0] + A[1]);
    }
    return energy / (0.5 * RIGIDITY * CURVATURE * CURVATURE * area);
}

static int pattern(plot *p, cloth_sheet_pattern kind, const char *name, double *worst) {
    const int       line = plot_series(p, name);
    const double    degree = acos(-1.0) / 180;
    cloth_mesh     *mesh = NULL;
    cloth_topology *topology = NULL;
    double         *x = NULL, row = kind == CLOTH_SHEET_EQUILATERAL ? EDGE * sqrt(0.75) : EDGE;
    int             angle, status = 1;
    if (cloth_mesh_sheet(NULL, kind, NX, NX + 1, EDGE * (NX - 1), row * NX, &mesh)) goto done;
    if (cloth_topology_create(NULL, mesh->nv, mesh->nf, mesh->faces, &topology)) goto done;
    x = (double *)malloc(3 * (size_t)mesh->nv * sizeof *x);
    if (!x) goto done;
    printf("%-12s", name);
    for (angle = 0; angle <= 180; angle += 5) {
        const double r = ratio(mesh, topology, row, angle * degree, x);
        if (r > *worst) *worst = r;
        if (angle % 15 == 0 && angle <= 135) printf(" %7.4f", r);
        plot_point(p, line, angle, r, NULL);
    }
    printf("\n");
    status = 0;
done:
    free(x);
    cloth_topology_destroy(NULL, topology), cloth_mesh_destroy(NULL, mesh);
    return status;
}

int main(void) {
    plot *p = plot_open("Bending rigidity of a hinge sheet by direction",
                        "direction of the curvature (degrees from x)", "rigidity over D");
    const char *error;
    double worst[3] = {0, 0, 0};
    int    angle, failed;
    plot_range(p, 0, 0, 180);
    plot_range(p, 1, 0, 3.2);
    printf("degrees     ");
    for (angle = 0; angle <= 135; angle += 15) printf(" %7d", angle);
    printf("\n");
    failed = pattern(p, CLOTH_SHEET_EQUILATERAL, "equilateral", &worst[0]) ||
             pattern(p, CLOTH_SHEET_ALTERNATING, "alternating", &worst[1]) ||
             pattern(p, CLOTH_SHEET_DIAGONAL, "one diagonal", &worst[2]);
    error = plot_close(p, "out/09_mesh_bias.svg");
    if (error) fprintf(stderr, "out/09_mesh_bias.svg: %s\n", error);
    if (failed || error) return 1;
    printf("at worst: equilateral %.3f D, alternating %.3f D, one diagonal %.3f D\n", worst[0],
           worst[1], worst[2]);
    return 0;
}
