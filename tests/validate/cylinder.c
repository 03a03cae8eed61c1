/* cylinder.c - the rigidity that hinges give a sheet rolled about any axis, by mesh pattern.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. validate/cylinder.c -lm
 *
 * The vertices of a flat sheet are put on a cylinder of curvature kappa whose generators are
 * square to the direction phi: D_eff = 2 E/(kappa^2 area) with E the hinges' energy and D the
 * material's rigidity. A third of A1 + A2 counts as a hinge's area; hinges outside one period of
 * the pattern are switched off (hinge_scale = 0). D_eff/D is 1 for all directions on equilateral
 * triangles only: hinge bending depends on the mesh, and refinement does not remove it. */
#include "statics.h"

#define CELLS 20                            /* along a side                                    */

static const double pi = 3.14159265358979323846;

enum { EQUILATERAL, DIAGONAL, ALTERNATING, FOUR, DELAUNAY, PATTERNS };

static double cross(const double *a, const double *b, const double *c) {
    return (b[0] - a[0]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[0] - a[0]);
}

/* d is inside the circle through a, b, c (counter-clockwise in x, z). */
static int in_circle(const double *a, const double *b, const double *c, const double *d) {
    const double *p[3] = {a, b, c};
    double        m[3][3];
    int           i;
    for (i = 0; i < 3; i++) {
        m[i][0] = p[i][0] - d[0];
        m[i][1] = p[i][2] - d[2];
        m[i][2] = m[i][0] * m[i][0] + m[i][1] * m[i][1];
    }
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
           - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
           + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) > 1e-12;
}

/* Flips edges until the circle of every triangle is empty (Lawson); returns the flips. */
static int delaunay(const double *x, int nv, int nf, int *faces) {
    int *left = (int *)malloc((size_t)(nv * nv) * sizeof *left), flips = 0, again = 1;
    int  f, k, round;
    for (round = 0; again && round < 100; round++) {
        again = 0;
        for (k = 0; k < nv * nv; k++) left[k] = -1;
        for (f = 0; f < 3 * nf; f++)
            left[faces[f] * nv + faces[f - f % 3 + (f + 1) % 3]] = f;
        for (f = 0; f < 3 * nf; f++) {
            const int a = faces[f], b = faces[f - f % 3 + (f % 3 + 1) % 3];
            const int c = faces[f - f % 3 + (f % 3 + 2) % 3], g = left[b * nv + a];
            int       d, e;
            if (g < 0 || faces[g] != b || faces[g - g % 3 + (g % 3 + 1) % 3] != a) continue;
            d = faces[g - g % 3 + (g % 3 + 2) % 3];
            if (left[a * nv + b] != f || !in_circle(x + 3 * c, x + 3 * b, x + 3 * a, x + 3 * d))
                continue;
            e = f - f % 3;                  /* a b c and b a d become a d c and d b c          */
            faces[e] = a;
            faces[e + 1] = d;
            faces[e + 2] = c;
            e = g - g % 3;
            faces[e] = d;
            faces[e + 1] = b;
            faces[e + 2] = c;
            for (k = 0; k < nv * nv; k++)   /* what the two held is found anew next round      */
                if (left[k] / 3 == f / 3 || left[k] / 3 == g / 3) left[k] = -1;
            flips++;
            again = 1;
        }
    }
    free(left);
    return flips;
}

/* Four triangles to a square: corners, then centres. */
static void four_per_square(cloth_mesh *m) {
    const int n = CELLS + 1;
    int       i, j, k, f = 0;
    for (j = 0; j < n; j++)
        for (i = 0; i < n; i++) {
            m->x[3 * (j * n + i)] = i;
            m->x[3 * (j * n + i) + 2] = j;
        }
    for (j = 0; j < CELLS; j++)
        for (i = 0; i < CELLS; i++) {
            const int centre = n * n + j * CELLS + i, c = j * n + i;
            const int corner[4] = {c, c + n, c + n + 1, c + 1};
            m->x[3 * centre] = i + 0.5;
            m->x[3 * centre + 2] = j + 0.5;
            for (k = 0; k < 4; k++, f++) {
                m->faces[3 * f] = corner[k];
                m->faces[3 * f + 1] = corner[(k + 1) % 4];
                m->faces[3 * f + 2] = centre;
            }
        }
    m->nv = n * n + CELLS * CELLS;
    m->nf = f;
}

/* Edges of length 1 along x. *tall: height of a row. */
static void make(int which, unsigned long long seed, cloth_mesh *m, double *tall) {
    const int                 shifted = which == EQUILATERAL || which == DELAUNAY;
    const cloth_sheet_pattern pattern = shifted             ? CLOTH_SHEET_EQUILATERAL
                                      : which == DIAGONAL ? CLOTH_SHEET_DIAGONAL
                                                            : CLOTH_SHEET_ALTERNATING;
    cloth_mesh *sheet = NULL;
    int         i, k;
    memset(m, 0, sizeof *m);
    *tall = shifted ? sqrt(0.75) : 1;
    m->x = (double *)calloc(3 * 1000, sizeof *m->x);
    m->faces = (int *)calloc(3 * 2000, sizeof *m->faces);
    if (which == FOUR) {
        four_per_square(m);
        return;
    }
    CHECK(cloth_mesh_sheet(NULL, pattern, CELLS + 1, CELLS + 1, CELLS, CELLS * *tall, &sheet)
          == CLOTH_OK);
    m->nv = sheet->nv;
    m->nf = sheet->nf;
    memcpy(m->x, sheet->x, 3 * (size_t)m->nv * sizeof *m->x);
    memcpy(m->faces, sheet->faces, 3 * (size_t)m->nf * sizeof *m->faces);
    cloth_mesh_destroy(NULL, sheet);
    if (which != DELAUNAY) return;
    for (i = 0; i < m->nv; i++)
        for (k = 0; k < 3; k += 2) {
            const double at = m->x[3 * i + k] / (k ? *tall : 1);
            if (at > 0.6 && at < CELLS - 0.6) m->x[3 * i + k] += ref_uniform(&seed, -0.25, 0.25);
        }
    CHECK(delaunay(m->x, m->nv, m->nf, m->faces) > 0);
}

/* Hinges whose middle lies in the window keep their stiffness; returns their area. */
static double keep_window(scene *s, double tall) {
    const cloth_topology *t = cloth_model_topology(s->model);
    cloth_params         *p = cloth_sim_params(s->sim);
    const double         *x = s->mesh->x;
    double                area = 0;
    int                   h, k;
    for (h = 0; h < t->nh; h++) {
        const int   *v = t->hinges + 4 * h;
        const double mx = 0.5 * (x[3 * v[0]] + x[3 * v[1]]);
        const double mz = 0.5 * (x[3 * v[0] + 2] + x[3 * v[1] + 2]) / tall;
        p->hinge_scale[h] = mx > 2.1 && mx < 18.1 && mz > 2.1 && mz < 18.1;
        for (k = 2; k < 4 && p->hinge_scale[h] > 0; k++)
            area += fabs(cross(x + 3 * v[0], x + 3 * v[1], x + 3 * v[k])) / 6;
    }
    CHECK(cloth_sim_params_changed(s->sim) == CLOTH_OK);
    return area;
}

static double rigidity(int which, unsigned long long seed, double degrees) {
    const double kappa = 1e-3, phi = degrees * pi / 180;
    double       tall, area = 1, *x;
    cloth_ledger ledger;
    cloth_mesh   mesh;
    scene        s;
    int          i;
    make(which, seed, &mesh, &tall);
    scene_begin(&s, &mesh);
    scene_material(&s, 1, 1, 0, 1);
    memset(&ledger, 0, sizeof ledger);
    if (scene_start(&s)) {
        area = keep_window(&s, tall);
        x = scene_x(&s);
        for (i = 0; i < mesh.nv; i++) {
            const double u = mesh.x[3 * i] * cos(phi) + mesh.x[3 * i + 2] * sin(phi);
            const double w = mesh.x[3 * i + 2] * cos(phi) - mesh.x[3 * i] * sin(phi);
            const double r = sin(kappa * u) / kappa;
            x[3 * i] = r * cos(phi) - w * sin(phi);
            x[3 * i + 1] = (1 - cos(kappa * u)) / kappa;
            x[3 * i + 2] = r * sin(phi) + w * cos(phi);
        }
        cloth_sim_state_changed(s.sim);
        CHECK(cloth_sim_energy(s.sim, &ledger) == CLOTH_OK);
    }
    s.mesh = NULL;
    scene_end(&s);
    free(mesh.x);
    free(mesh.faces);
    return 2 * ledger.bend / (kappa * kappa * area);
}

/* D_eff/k of the formula that has k = 2 D/3: divided by 3/2 here. */
static void by_direction(void) {
    static const char  *name[PATTERNS] = {"equilateral", "one diagonal", "alternating",
                                          "4 per square", "jittered Delaunay"};
    static const double degrees[6] = {0, 30, 45, 60, 90, 135};
    static const double known[FOUR + 1][6] = {
        {1.5, 1.5, 1.5, 1.5, 1.5, 1.5},         {1.5, 3.92404, 4.5, 3.92404, 1.5, 1.5},
        {1.5, 2.0625, 2.25, 2.0625, 1.5, 2.25}, {2.25, 1.6875, 1.5, 1.6875, 2.25, 1.5},
    };
    int k, c;
    printf("  D_eff/D                0      30      45      60      90     135  degrees\n");
    for (k = 0; k < PATTERNS; k++) {
        double worst = 0;
        printf("  %-17s", name[k]);
        for (c = 0; c < 6; c++) {
            const double D = rigidity(k, 3, degrees[c]);
            printf(" %7.5f", D);
            if (k == DELAUNAY) {
                CHECK(D > 1.1 && D < 1.17);     /* known for three other meshes: 1.11 to 1.16  */
                continue;
            }
            CHECK_NEAR(D, known[k][c] / 1.5, 1e-4);
            worst = fmax(worst, fabs(D - known[k][c] / 1.5));
        }
        if (k == DELAUNAY) printf("\n");
        else printf("  error %.1e\n", worst);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(by_direction);
    return TEST_END();
}
