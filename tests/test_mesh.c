/* test_mesh.c - topology, mesh check, generators.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_mesh.c -lm */
#include "clothsim.h"
#include "test.h"
#include "host.h"

/* --- the angle between two faces, without the kit: rotate the hinge so that its edge is +z and
 * measure both wings in the plane; convex seen from the normals' side is positive --- */
static double fold_angle(const double *x0, const double *x1, const double *x2, const double *x3) {
    double e[3], u[3], w[3], l, s, p2[2], p3[2], a;
    int    k;
    for (k = 0; k < 3; k++) e[k] = x1[k] - x0[k];
    l = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
    for (k = 0; k < 3; k++) e[k] /= l;
    for (s = 0, k = 0; k < 3; k++) s += (x2[k] - x0[k]) * e[k];
    for (k = 0; k < 3; k++) u[k] = x2[k] - x0[k] - s * e[k];
    l = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (k = 0; k < 3; k++) u[k] /= l;
    w[0] = e[1] * u[2] - e[2] * u[1];           /* the left face's normal */
    w[1] = e[2] * u[0] - e[0] * u[2];
    w[2] = e[0] * u[1] - e[1] * u[0];
    p2[0] = 1;
    p2[1] = 0;
    for (p3[0] = p3[1] = 0, k = 0; k < 3; k++) {
        p3[0] += (x3[k] - x0[k]) * u[k];
        p3[1] += (x3[k] - x0[k]) * w[k];
    }
    /* flat: the right wing points to -u; dropping away from the normal is convex */
    a = atan2(-p3[1], -p3[0]) - atan2(p2[1], p2[0]);
    return a;
}

static const int tetra[] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
static const double tetra_x[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};

static void check_incidence(const cloth_topology *t, const int *faces) {
    int v, e, i, j, n = 0;
    CHECK(t->vf_start[0] == 0 && t->vf_start[t->nv] == 3 * t->nf);
    CHECK(t->vv_start[0] == 0 && t->vv_start[t->nv] == 2 * t->ne);
    for (v = 0; v < t->nv; v++) {
        for (i = t->vf_start[v]; i < t->vf_start[v + 1]; i++) {
            const int *f = faces + 3 * t->vf[i];
            if (f[0] != v && f[1] != v && f[2] != v) n++;
            if (i > t->vf_start[v] && t->vf[i] <= t->vf[i - 1]) n++;
        }
        for (i = t->vv_start[v] + 1; i < t->vv_start[v + 1]; i++)
            if (t->vv[i] <= t->vv[i - 1]) n++;
    }
    for (e = 0; e < t->ne; e++) {
        const int a = t->edges[2 * e], b = t->edges[2 * e + 1];
        int       found = 0;
        if (a >= b) n++;
        if (e && (t->edges[2 * e - 2] > a || (t->edges[2 * e - 2] == a &&
                                              t->edges[2 * e - 1] >= b))) n++;
        for (i = t->vv_start[a]; i < t->vv_start[a + 1]; i++) found += t->vv[i] == b;
        for (i = t->vv_start[b]; i < t->vv_start[b + 1]; i++) found += t->vv[i] == a;
        if (found != 2) n++;
        for (j = 0; j < 2; j++) {
            const int f = t->edge_faces[2 * e + j];
            if (f < 0) continue;
            for (found = 0, i = 0; i < 3; i++) found += t->face_edges[3 * f + i] == e;
            if (found != 1) n++;
        }
    }
    for (i = 0; i < 3 * t->nf; i++) {
        const int a = faces[i], b = faces[i % 3 == 2 ? i - 2 : i + 1];
        const int *ends = t->edges + 2 * t->face_edges[i];
        if (ends[0] != (a < b ? a : b) || ends[1] != (a < b ? b : a)) n++;
    }
    CHECK(n == 0);
}

/* every hinge is (x0 x1 x2), (x1 x0 x3) as two of the faces are wound */
static void check_hinges(const cloth_topology *t, const int *faces) {
    int h, s, k, n = 0;
    for (h = 0; h < t->nh; h++) {
        const int *q = t->hinges + 4 * h, e = t->hinge_edge[h];
        const int  want[2][3] = {{q[0], q[1], q[2]}, {q[1], q[0], q[3]}};
        if (t->edges[2 * e] != q[0] || t->edges[2 * e + 1] != q[1]) n++;
        for (s = 0; s < 2; s++) {
            const int *f = faces + 3 * t->hinge_faces[2 * h + s];
            int        ok = 0;
            if (t->edge_faces[2 * e + s] != t->hinge_faces[2 * h + s]) n++;
            for (k = 0; k < 3; k++)
                ok += f[k] == want[s][0] && f[(k + 1) % 3] == want[s][1] &&
                      f[(k + 2) % 3] == want[s][2];
            if (ok != 1) n++;
        }
    }
    CHECK(n == 0);
}

static void topology_tetrahedron(void) {
    cloth_topology *t = NULL;
    int             h;
    CHECK(cloth_topology_create(NULL, 4, 4, tetra, &t) == CLOTH_OK);
    if (!t) return;
    CHECK(t->nv == 4 && t->nf == 4 && t->ne == 6 && t->nh == 6 && t->nloop == 0);
    check_incidence(t, tetra);
    check_hinges(t, tetra);
    for (h = 0; h < t->nh; h++) {
        const int *q = t->hinges + 4 * h;
        const double angle = fold_angle(tetra_x + 3 * q[0], tetra_x + 3 * q[1],
                                        tetra_x + 3 * q[2], tetra_x + 3 * q[3]);
        CHECK(angle > 1.5 && angle < 2.2);      /* wound outwards: convex, 90 or 125 degrees */
    }
    cloth_topology_destroy(NULL, t);
}

/* a ridge along y seen from above: 0 and 1 on the ridge, the wings lower by 1 */
static void topology_fold_sign(void) {
    static const double x[] = {0, 0, 0, 0, 1, 0, -1, .5, -1, 1, .5, -1};
    static const int    up[] = {0, 1, 2, 1, 0, 3}, down[] = {1, 0, 2, 0, 1, 3};
    cloth_topology     *t = NULL;
    int                 side;
    for (side = 0; side < 2; side++) {
        const int *faces = side ? down : up, *q;
        CHECK(cloth_topology_create(NULL, 4, 2, faces, &t) == CLOTH_OK);
        if (!t) return;
        CHECK(t->nh == 1 && t->ne == 5 && t->nloop == 1);
        check_hinges(t, faces);
        q = t->hinges;
        CHECK_NEAR(fold_angle(x + 3 * q[0], x + 3 * q[1], x + 3 * q[2], x + 3 * q[3]),
                   (side ? -2 : 2) * atan(1.0), 1e-15);
        cloth_topology_destroy(NULL, t);
    }
}

/* a ring of 8 triangles: an annulus; vertices 0..3 inside, 4..7 outside; and 8 is isolated */
static void topology_annulus(void) {
    int             faces[24], k;
    cloth_topology *t = NULL;
    for (k = 0; k < 4; k++) {
        const int n = (k + 1) % 4;
        const int two[] = {k, 4 + k, 4 + n, k, 4 + n, n};
        memcpy(faces + 6 * k, two, sizeof two);
    }
    CHECK(cloth_topology_create(NULL, 9, 8, faces, &t) == CLOTH_OK);
    if (!t) return;
    CHECK(8 - t->ne + t->nf == 0 && t->nh == 8 && t->nloop == 2);
    check_incidence(t, faces);
    check_hinges(t, faces);
    CHECK(t->loop_start[1] == 4 && t->loop_start[2] == 8);
    for (k = 0; k < 4; k++) {                   /* surface on the left: the hole runs backwards */
        static const int inner[] = {0, 3, 2, 1}, outer[] = {4, 5, 6, 7};
        CHECK(t->loop_vertex[k] == inner[k] && t->loop_vertex[4 + k] == outer[k]);
    }
    CHECK(t->vf_start[9] == t->vf_start[8] && t->vv_start[9] == t->vv_start[8]);
    cloth_topology_destroy(NULL, t);
}

/* two triangles that share one vertex: two loops, not one figure of eight */
static void topology_bow_tie(void) {
    static const int faces[] = {2, 0, 1, 2, 3, 4};
    cloth_topology  *t = NULL;
    CHECK(cloth_topology_create(NULL, 5, 2, faces, &t) == CLOTH_OK);
    if (!t) return;
    CHECK(t->nloop == 2 && t->loop_start[1] == 3 && t->loop_start[2] == 6 && t->nh == 0);
    CHECK(t->loop_vertex[0] == 0 && t->loop_vertex[1] == 1 && t->loop_vertex[2] == 2);
    CHECK(t->loop_vertex[3] == 2 && t->loop_vertex[4] == 3 && t->loop_vertex[5] == 4);
    cloth_topology_destroy(NULL, t);
}

static void topology_refusals(void) {
    static const struct {
        int          nv, nf, faces[12];
        cloth_status status;
        const char  *text;
    } bad[] = {
        {5, 3, {0, 1, 2, 1, 0, 3, 0, 1, 4}, CLOTH_ERR_MESH, "edge 0-1 has 3 faces"},
        {4, 2, {0, 1, 2, 0, 1, 3}, CLOTH_ERR_MESH, "faces 0 and 1 both run 0 -> 1"},
        {3, 2, {0, 1, 2, 0, 2, 1}, CLOTH_ERR_MESH, "face 1 has the corners of face 0"},
        {3, 2, {0, 1, 2, 1, 2, 0}, CLOTH_ERR_MESH, "face 1 has the corners of face 0"},
        {3, 1, {0, 1, 3}, CLOTH_ERR_MESH, "faces[0] corner 2 = 3 is outside 0 .. 2"},
        {3, 1, {0, -1, 2}, CLOTH_ERR_MESH, "faces[0] corner 1 = -1"},
        {3, 1, {0, 1, 0}, CLOTH_ERR_MESH, "faces[0] = 0 1 0 repeats"},
        {-1, 1, {0, 1, 2}, CLOTH_ERR_ARGUMENT, "nv = -1"},
        {3, -1, {0, 1, 2}, CLOTH_ERR_ARGUMENT, "nf = -1"},
        {3, 0x7fffffff, {0, 1, 2}, CLOTH_ERR_ARGUMENT, "nf = 2147483647"},
        {0x7fffffff, 1, {0, 1, 2}, CLOTH_ERR_ARGUMENT, "nv = 2147483647"},
    };
    host        h;
    cloth_hooks hooks;
    size_t      i;
    for (i = 0; i < sizeof bad / sizeof *bad; i++) {
        cloth_topology *t = (cloth_topology *)&h;
        hooks = host_hooks(&h);
        CHECK(cloth_topology_create(&hooks, bad[i].nv, bad[i].nf, bad[i].faces, &t) ==
              bad[i].status);
        CHECK(t == NULL && h.live == 0 && h.errors == 1);
        if (!CHECK(strstr(h.text, bad[i].text) != NULL)) printf("%s", h.text);
    }
    hooks = host_hooks(&h);
    CHECK(cloth_topology_create(&hooks, 3, 1, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    {
        cloth_topology *t = (cloth_topology *)&h;
        CHECK(cloth_topology_create(&hooks, 3, 1, NULL, &t) == CLOTH_ERR_ARGUMENT && !t);
        CHECK(cloth_topology_create(&hooks, 0, 0, NULL, &t) == CLOTH_OK && t && t->ne == 0);
        cloth_topology_destroy(&hooks, t);
        CHECK(h.live == 0);
    }
    cloth_topology_destroy(NULL, NULL);
}

static void topology_failing_allocator(void) {
    int fail;
    for (fail = 1;; fail++) {
        host            h;
        cloth_hooks     hooks = host_hooks(&h);
        cloth_topology *t;
        cloth_status    status;
        h.fail_at = fail;
        status = cloth_topology_create(&hooks, 4, 4, tetra, &t);
        if (status == CLOTH_OK) {
            cloth_topology_destroy(&hooks, t);
            CHECK(h.live == 0);
            break;
        }
        CHECK(status == CLOTH_ERR_MEMORY && t == NULL && h.live == 0 && h.errors == 1);
    }
    CHECK(fail == 3);                       /* each of two blocks was refused once */
}

/* of its two blocks each is refused once */
static void weld_failing_allocator(void) {
    cloth_mesh *a = NULL, *w = NULL;
    int         fail;
    CHECK(cloth_mesh_ball(NULL, 1, 4, &a) == CLOTH_OK);
    for (fail = 1; fail < 10; fail++) {
        host         h;
        cloth_hooks  hooks = host_hooks(&h);
        cloth_status status;
        h.fail_at = fail;
        status = cloth_mesh_weld(&hooks, a, 1e-9, &w);
        CHECK(status == (fail < 3 ? CLOTH_ERR_MEMORY : CLOTH_OK) && (w != NULL) == !status);
        cloth_mesh_destroy(&hooks, w);
        CHECK(h.live == 0);
        if (!status) break;
    }
    CHECK(fail == 3);
    cloth_mesh_destroy(NULL, a);
}

/* a fan of 10^6 triangles around vertex 0 */
static void topology_million_faces_on_a_vertex(void) {
    const int       nf = 1000000;
    int            *faces = (int *)malloc(3 * (size_t)nf * sizeof *faces), i;
    cloth_topology *t = NULL;
    clock_t         start;
    double          seconds;
    for (i = 0; i < nf; i++) {
        faces[3 * i] = 0;
        faces[3 * i + 1] = 1 + i;
        faces[3 * i + 2] = 2 + i;
    }
    start = clock();
    CHECK(cloth_topology_create(NULL, nf + 2, nf, faces, &t) == CLOTH_OK);
    seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    printf("  10^6 faces on one vertex: topology %.2f s\n", seconds);
    CHECK(seconds < 5);
    if (t) {
        CHECK(t->ne == 2 * nf + 1 && t->nh == nf - 1 && t->nloop == 1);
        CHECK(t->loop_start[1] == nf + 2 && t->vf_start[1] == nf);
        cloth_topology_destroy(NULL, t);
    }
    free(faces);
}

/* --- generators --- */

static double edge_x(const cloth_mesh *m, int f, int k) {
    const double *a = m->x + 3 * m->faces[3 * f + k], *b = m->x + 3 * m->faces[3 * f + (k + 1) % 3];
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static double edge_X(const cloth_mesh *m, int f, int k) {
    const double *a = m->X + 6 * f + 2 * k, *b = m->X + 6 * f + 2 * ((k + 1) % 3);
    return hypot(a[0] - b[0], a[1] - b[1]);
}

static void normal_of(const cloth_mesh *m, int f, double *n) {
    const double *a = m->x + 3 * m->faces[3 * f], *b = m->x + 3 * m->faces[3 * f + 1];
    const double *c = m->x + 3 * m->faces[3 * f + 2];
    n[0] = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]);
    n[1] = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2]);
    n[2] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static double area_x(const cloth_mesh *m) {
    double sum = 0, n[3];
    int    f;
    for (f = 0; f < m->nf; f++) {
        normal_of(m, f, n);
        sum += 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    }
    return sum;
}

/* signed area of the pattern */
static double area_X(const cloth_mesh *m) {
    double sum = 0;
    int    f;
    for (f = 0; f < m->nf; f++) {
        const double *P = m->X + 6 * f;
        sum += 0.5 * ((P[2] - P[0]) * (P[5] - P[1]) - (P[4] - P[0]) * (P[3] - P[1]));
    }
    return sum;
}

static double smallest_angle(const cloth_mesh *m) {
    double least = 10;
    int    f, k;
    for (f = 0; f < m->nf; f++)
        for (k = 0; k < 3; k++) {
            const double a = edge_x(m, f, k), b = edge_x(m, f, (k + 1) % 3);
            const double c = edge_x(m, f, (k + 2) % 3);
            least = fmin(least, acos((b * b + c * c - a * a) / (2 * b * c)));
        }
    return least * 180 / 3.14159265358979;
}

/* passes the check without a word, the pattern is isometric, the topology has this Euler number
 * and as many loops */
static void check_mesh(const cloth_mesh *m, int euler, int loops) {
    host              h;
    cloth_hooks       hooks = host_hooks(&h);
    cloth_mesh_report report;
    cloth_topology   *t = NULL;
    int               f, k, n = 0;
    CHECK(cloth_mesh_check(&hooks, m->nv, m->x, m->nf, m->faces, m->X, &report) == CLOTH_OK);
    if (!CHECK(h.lines == 0 && report.warnings == 0)) printf("%s", h.text);
    CHECK(cloth_topology_create(&hooks, m->nv, m->nf, m->faces, &t) == CLOTH_OK);
    if (t) {
        CHECK(m->nv - t->ne + m->nf == euler && t->nloop == loops);
        check_hinges(t, m->faces);
        check_incidence(t, m->faces);
    }
    cloth_topology_destroy(&hooks, t);
    CHECK(h.live == 0);
    for (f = 0; f < m->nf; f++)
        for (k = 0; k < 3; k++)
            n += !(fabs(edge_x(m, f, k) - edge_X(m, f, k)) <= 1e-13 * edge_x(m, f, 0));
    CHECK(n == 0);
}

static void generator_sheets(void) {
    int pattern, nx, ny, f, k;
    for (pattern = 0; pattern < 3; pattern++)
        for (nx = 2; nx < 7; nx++)
            for (ny = 2; ny < 7; ny++) {
                cloth_mesh *m = NULL;
                int         n = 0;
                CHECK(cloth_mesh_sheet(NULL, (cloth_sheet_pattern)pattern, nx, ny, 2.0, 0.75,
                                       &m) == CLOTH_OK);
                if (!m) return;
                CHECK(m->nv == nx * ny + (pattern == CLOTH_SHEET_EQUILATERAL ? ny / 2 : 0));
                CHECK(m->nf == (ny - 1) * (pattern == CLOTH_SHEET_EQUILATERAL ? 2 * nx - 1
                                                                              : 2 * nx - 2));
                check_mesh(m, 1, 1);
                CHECK_NEAR(area_x(m), 1.5, 1e-14);
                CHECK_NEAR(area_X(m), 1.5, 1e-14);
                for (f = 0; f < m->nf; f++) {
                    double normal[3];
                    normal_of(m, f, normal);
                    n += !(normal[1] > 0);
                }
                for (k = 0; k < m->nv; k++) n += m->x[3 * k + 1] != 0;
                CHECK(n == 0);
                cloth_mesh_destroy(NULL, m);
            }
}

/* vertices and diagonals of the alternating grid as the yardstick has them */
static void generator_alternating_layout(void) {
    static const int want[] = {0, 4, 1, 0, 3, 4, 1, 4, 2, 2, 4, 5};
    cloth_mesh      *m = NULL;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 3, 2, 1.0, 1.0, &m) == CLOTH_OK);
    if (!m) return;
    CHECK(memcmp(m->faces, want, sizeof want) == 0);
    CHECK(m->x[3 * 4] == 0.5 && m->x[3 * 4 + 2] == 1.0);
    cloth_mesh_destroy(NULL, m);
}

static void generator_equilateral_edges(void) {
    cloth_mesh *m = NULL;
    const int   nx = 9, ny = 7;
    const double a = 1.0 / (nx - 1), height = (ny - 1) * a * sqrt(0.75);
    int         f, k, full = 0;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_EQUILATERAL, nx, ny, 1.0, height, &m) == CLOTH_OK);
    if (!m) return;
    for (f = 0; f < m->nf; f++) {
        int equal = 0;
        for (k = 0; k < 3; k++) equal += fabs(edge_x(m, f, k) - a) < 1e-15;
        full += equal == 3;
    }
    CHECK(full == m->nf - 2 * (ny - 1));        /* all but the half triangles at the row ends  */
    CHECK(m->x[3 * (m->nv - 1)] == 1.0);
    cloth_mesh_destroy(NULL, m);
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_EQUILATERAL, nx, 0, 1.0, height * 1.01, &m) ==
          CLOTH_OK);
    if (m) CHECK(m->nv == nx * ny + ny / 2);
    cloth_mesh_destroy(NULL, m);
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_EQUILATERAL, nx, 0, 1.0, 0.1 * a, &m) == CLOTH_OK);
    if (m) CHECK(m->nv == nx * 2 + 1);
    cloth_mesh_destroy(NULL, m);
}

static void generator_tube(void) {
    int around, along, f;
    for (around = 3; around < 9; around++)
        for (along = 2; along < 6; along++) {
            cloth_mesh *m = NULL;
            int         n = 0;
            CHECK(cloth_mesh_tube(NULL, 0.3, 1.1, around, along, &m) == CLOTH_OK);
            if (!m) return;
            CHECK(m->nv == around * along && m->nf == 2 * around * (along - 1));
            check_mesh(m, 0, 2);
            CHECK_REL(area_x(m), area_X(m), 1e-14);
            for (f = 0; f < m->nf; f++) {
                double        normal[3];
                const double *p = m->x + 3 * m->faces[3 * f], *q = m->x + 3 * m->faces[3 * f + 1];
                normal_of(m, f, normal);
                n += !(normal[0] * (p[0] + q[0]) + normal[2] * (p[2] + q[2]) > 0);
            }
            CHECK(n == 0);
            cloth_mesh_destroy(NULL, m);
        }
}

static void generator_disc(void) {
    int rings;
    for (rings = 1; rings < 20; rings++) {
        cloth_mesh  *m = NULL;
        const int    n = 6 * rings;
        const double polygon = 0.5 * n * sin(2 * 3.14159265358979323846 / n) * 0.25;
        CHECK(cloth_mesh_disc(NULL, 0.5, rings, &m) == CLOTH_OK);
        if (!m) return;
        CHECK(m->nv == 1 + 3 * rings * (rings + 1) && m->nf == 6 * rings * rings);
        check_mesh(m, 1, 1);
        CHECK_REL(area_x(m), polygon, 1e-13);
        CHECK_REL(area_X(m), polygon, 1e-13);
        if (!CHECK(smallest_angle(m) > 40)) printf("%d rings: %g\n", rings, smallest_angle(m));
        cloth_mesh_destroy(NULL, m);
    }
}

static void generator_merge(void) {
    cloth_mesh *one = NULL, *two = NULL, *all = NULL, *nested = NULL, *list[3];
    host        h;
    cloth_hooks hooks = host_hooks(&h);
    int         f, bad = 0;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_DIAGONAL, 3, 4, 1.0, 1.0, &one) == CLOTH_OK);
    CHECK(cloth_mesh_tube(NULL, 0.3, 1.1, 5, 3, &two) == CLOTH_OK);
    if (!one || !two) return;
    two->X = NULL;                              /* so that it must be laid flat */
    list[0] = one;
    list[1] = two;
    CHECK(cloth_mesh_merge(NULL, list, 2, &all) == CLOTH_OK);
    if (!all) return;
    CHECK(all->nv == 12 + 15 && all->nf == 12 + 20 && all->npart == 2 && all->nr == 0);
    check_mesh(all, 1, 3);
    for (f = 0; f < all->nf; f++) bad += all->part[f] != (f >= 12);
    CHECK(bad == 0 && all->faces[3 * 12] == 12 + two->faces[0]);
    list[0] = all;
    list[1] = one;
    CHECK(cloth_mesh_merge(NULL, list, 2, &nested) == CLOTH_OK);
    if (nested) CHECK(nested->npart == 3 && nested->part[0] == 0 && nested->part[12] == 1 &&
                      nested->part[nested->nf - 1] == 2);
    cloth_mesh_destroy(NULL, nested);
    two->x[0] = HOST_NAN;
    list[1] = two;
    CHECK(cloth_mesh_merge(&hooks, list, 2, &nested) == CLOTH_ERR_NONFINITE && !nested);
    CHECK(strstr(h.text, "meshes[1].X is NULL") == h.text);
    list[1] = NULL;
    CHECK(cloth_mesh_merge(NULL, list, 2, &nested) == CLOTH_ERR_ARGUMENT && !nested);
    CHECK(cloth_mesh_merge(NULL, list, 0, &nested) == CLOTH_ERR_ARGUMENT && !nested);
    CHECK(cloth_mesh_merge(NULL, NULL, 1, &nested) == CLOTH_ERR_ARGUMENT && !nested);
    CHECK(cloth_mesh_merge(NULL, list, 1, NULL) == CLOTH_ERR_ARGUMENT);
    cloth_mesh_destroy(NULL, all);
    cloth_mesh_destroy(NULL, two);
    cloth_mesh_destroy(NULL, one);
    cloth_mesh_destroy(NULL, NULL);
}

/* render corners of one mesh, vertices standing in for those of the other */
static void generator_merge_render_corners(void) {
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 5 6\nvt 7 8\nf 1/2 2/1 3/2\n";
    static const int  vertex[] = {0, 1, 2, 3, 4, 5, 6, 7, 8}, faces[] = {0, 1, 2, 3, 4, 5, 6, 7, 8};
    cloth_mesh       *a = NULL, *all = NULL, *list[3], huge;
    CHECK(cloth_obj_parse(NULL, text, sizeof text - 1, NULL, &a) == CLOTH_OK);
    if (!a) return;
    huge = *a;                                  /* counts only: refused before a read */
    huge.nf = CLOTH_MAX_COUNT;
    list[0] = list[2] = a;
    list[1] = &huge;
    CHECK(cloth_mesh_merge(NULL, list, 2, &all) == CLOTH_ERR_CAPACITY && !all);
    huge = *a;
    huge.nr = 0;
    CHECK(cloth_mesh_merge(NULL, list, 3, &all) == CLOTH_OK);
    if (all) {
        CHECK(all->nr == 9 && !all->X && all->npart == 3);
        CHECK(memcmp(all->render_vertex, vertex, sizeof vertex) == 0);
        CHECK(memcmp(all->render_faces, faces, sizeof faces) == 0);
        CHECK(all->vt[0] == 7 && all->vt[3] == 6 && all->vt[6] == 0 && all->vt[12] == 7);
    }
    cloth_mesh_destroy(NULL, all);
    cloth_mesh_destroy(NULL, a);
}

/* Every mesh is looked at before a byte of it is copied; the sentence names mesh, field, value. */
static void generator_merge_checks(void) {
    static const char *const said[13] = {
        "meshes[1].x is NULL", "meshes[1].nv = -3", "meshes[1].faces is NULL",
        "meshes[1].faces[0] corner 2 = 77", "meshes[1].faces[0] corner 1 = -5",
        "meshes[1].part[0] = 5 is outside 0 .. 0", "meshes[1].npart = -1",
        "meshes[1].part[0]", "meshes[1].vt is NULL", "meshes[1].nr = -1", "meshes[1].nf = -1",
        "meshes[1].render_vertex[1] = 3", "meshes[1].render_faces[0] corner 2 = 3"};
    cloth_mesh *sheet = NULL, *all = NULL, *list[2], bad;
    int         k;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 2, 2, 1, 1, &sheet) == CLOTH_OK);
    for (k = 0; sheet && k < 13; k++) {
        double      x[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, vt[6] = {0, 0, 0, 0, 0, 0};
        int         faces[3] = {0, 1, 2}, part[1] = {0}, rv[3] = {0, 1, 2}, rf[3] = {0, 1, 2};
        host        h;
        cloth_hooks hooks = host_hooks(&h);
        memset(&bad, 0, sizeof bad);
        bad.nv = bad.nr = 3;
        bad.nf = bad.npart = 1;
        bad.x = x, bad.vt = vt;
        bad.faces = faces, bad.part = part, bad.render_vertex = rv, bad.render_faces = rf;
        list[0] = sheet, list[1] = &bad;
        CHECK(cloth_mesh_merge(&hooks, list, 2, &all) == CLOTH_OK && all->part[2] == 1);
        cloth_mesh_destroy(&hooks, all);
        switch (k) {
        case 0: bad.x = NULL; break;
        case 1: bad.nv = -3; break;
        case 2: bad.faces = NULL; break;
        case 3: faces[2] = 77; break;
        case 4: faces[1] = -5; break;
        case 5: part[0] = 5; break;
        case 6: bad.npart = -1; break;
        case 7: bad.npart = 0; break;
        case 8: bad.vt = NULL; break;
        case 9: bad.nr = -1; break;
        case 10: bad.nf = -1; break;
        case 11: rv[1] = 3; break;
        default: rf[2] = 3; break;
        }
        CHECK(cloth_mesh_merge(&hooks, list, 2, &all) == CLOTH_ERR_ARGUMENT && !all);
        CHECK(strstr(h.text, said[k]) != NULL && h.lines == 1 && h.live == 0);
    }
    cloth_mesh_destroy(NULL, sheet);
}

/* Six times the volume of faces [from, to). */
static double volume6(const cloth_mesh *m, int from, int to) {
    double sum = 0, n[3];
    for (; from < to; from++) {
        const double *p = m->x + 3 * m->faces[3 * from];
        normal_of(m, from, n);
        sum += p[0] * n[0] + p[1] * n[1] + p[2] * n[2];
    }
    return sum;
}

static void inside_out(const cloth_mesh *m) {
    for (int f = 0; f < m->nf; f++) {
        const int k = m->faces[3 * f];
        m->faces[3 * f] = m->faces[3 * f + 1], m->faces[3 * f + 1] = k;
    }
}

/* An edge of more than two faces is no boundary: what it belongs to may be closed all the same. */
static void orient_beside_edges_of_many_faces(void) {
    static const double size[3] = {1, 1, 1};
    cloth_mesh         *a = NULL, *b = NULL, *both = NULL, *w = NULL, *list[2], copied;
    int                *faces, turned = 0, i;
    CHECK(!cloth_mesh_box(NULL, size, &a) && !cloth_mesh_box(NULL, size, &b));
    for (i = 0; i < b->nv; i++) b->x[3 * i]++, b->x[3 * i + 2]++;   /* they share an edge */
    inside_out(b);
    list[0] = a, list[1] = b;
    CHECK(!cloth_mesh_merge(NULL, list, 2, &both) && !cloth_mesh_weld(NULL, both, 1e-9, &w));
    CHECK(w->nv == a->nv + b->nv - 2 && w->nf == a->nf + b->nf);
    CHECK(cloth_mesh_orient(NULL, w, &turned) == CLOTH_OK && turned == b->nf);
    CHECK_NEAR(volume6(w, 0, a->nf), 6, 1e-14);
    CHECK_NEAR(volume6(w, a->nf, w->nf), 6, 1e-14);
    cloth_mesh_destroy(NULL, w), both->x[4] = NAN;
    CHECK(cloth_mesh_weld(NULL, both, 1e-9, &w) == CLOTH_ERR_NONFINITE && !w);
    cloth_mesh_destroy(NULL, both), cloth_mesh_destroy(NULL, b), cloth_mesh_destroy(NULL, a);
    CHECK(cloth_mesh_ball(NULL, 1, 16, &a) == CLOTH_OK);    /* a face of it copied */
    inside_out(a);
    faces = (int *)malloc(3 * sizeof *faces * (size_t)(a->nf + 1));
    memcpy(faces, a->faces, 3 * sizeof *faces * (size_t)a->nf);
    memcpy(faces + 3 * a->nf, faces, 3 * sizeof *faces);
    copied = *a, copied.faces = faces, copied.nf++;
    CHECK(cloth_mesh_orient(NULL, &copied, &turned) == CLOTH_OK && turned == a->nf - 1);
    CHECK(volume6(&copied, 1, a->nf) > 0);
    free(faces), cloth_mesh_destroy(NULL, a);
}

/* `around` vertices of a ball are on its equator, whatever the number. */
static void generator_ball_equator(void) {
    for (int around = 3; around < 40; around++) {
        cloth_mesh *m = NULL;
        int         n = 0;
        CHECK(cloth_mesh_ball(NULL, 0.5, around, &m) == CLOTH_OK);
        if (!m) return;
        for (int i = 0; i < m->nv; i++)
            n += fabs(m->x[3 * i + 1]) < 1e-15 &&
                 fabs(hypot(m->x[3 * i], m->x[3 * i + 2]) - 0.5) < 1e-15;
        CHECK(n == around);
        cloth_mesh_destroy(NULL, m);
    }
}

/* Counts that an int does not hold, arrays that are not there, no memory: for the sanitizers. */
static void edges_of_c(void) {
    cloth_mesh *m = NULL, *both = NULL, *list[2], empty;
    host        h;
    cloth_hooks hooks = host_hooks(&h);
    int         turned, n;
    memset(&empty, 0, sizeof empty);
    CHECK(cloth_mesh_sheet(&hooks, CLOTH_SHEET_EQUILATERAL, -0x7fffffff - 1, 0, 1, 1, &m) ==
          CLOTH_ERR_ARGUMENT);
    CHECK(strstr(h.text, "nx = -2147483648") != NULL);
    CHECK(cloth_mesh_ball(&hooks, 1, 6, &m) == CLOTH_OK);
    list[0] = &empty, list[1] = m;
    CHECK(cloth_mesh_merge(&hooks, list, 2, &both) == CLOTH_OK && both->nv == m->nv);
    cloth_mesh_destroy(&hooks, both);
    for (n = 1; n < 9; n++) {
        h.calls = 0, h.fail_at = n;
        if (cloth_mesh_orient(&hooks, m, &turned) == CLOTH_OK) break;
        CHECK(h.live == 1);
    }
    CHECK(n > 2 && n < 9);
    cloth_mesh_destroy(&hooks, m);
}

/* With half an allocator nothing is taken, from the host or from malloc, and it is said why. */
static void half_an_allocator(void) {
    host        h;
    cloth_hooks hooks = host_hooks(&h), half = hooks;
    cloth_mesh *m = NULL;
    for (int k = 0; k < 2; k++) {
        half = hooks;
        if (k) half.allocator.alloc = NULL;
        else half.allocator.free = NULL;
        host_forget(&h);
        CHECK(cloth_mesh_disc(&half, 1, 2, &m) == CLOTH_ERR_MEMORY && !m && h.calls == 0);
        CHECK(strstr(h.text, "hooks.allocator: set both") == h.text);
    }
}

/* Each of a box's three sizes is looked at, and nothing is left in *out. */
static void generator_box_refusals(void) {
    const double bad[3] = {HOST_NAN, HOST_INFINITY, -1};
    host         h;
    cloth_hooks  hooks = host_hooks(&h);
    cloth_mesh   none, *m = &none;
    CHECK(cloth_mesh_box(&hooks, NULL, &m) == CLOTH_ERR_ARGUMENT && !m);
    for (int k = 0; k < 9; k++) {
        double size[3] = {1, 1, 1};
        char   word[10] = "size[?] =";
        size[k % 3] = bad[k / 3], word[5] = (char)('0' + k % 3);
        m = &none, host_forget(&h);
        CHECK(cloth_mesh_box(&hooks, size, &m) == CLOTH_ERR_ARGUMENT && !m);
        CHECK(strstr(h.text, word) == h.text && h.live == 0);
    }
}

/* What is taken has coordinates and a pattern within the range of doubles. */
static void generator_sizes(void) {
    static const double size[8] = {1e-308, 1e-160, 1e-70, 1e-20, 1, 1e70, 1e160, 1.7e308};
    int                 i, taken = 0, bad = 0;
    for (i = 0; i < 5 * 64; i++) {
        const double a = size[i % 8], b = size[i / 8 % 8], box[3] = {a, 1, b};
        cloth_mesh  *m = NULL;
        switch (i / 64) {
        case 0: cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 20, 20, a, b, &m); break;
        case 1: cloth_mesh_tube(NULL, a, b, 8, 30, &m); break;
        case 2: cloth_mesh_cylinder(NULL, a, b, 8, &m); break;
        case 3: cloth_mesh_box(NULL, box, &m); break;
        default: if (i % 2) cloth_mesh_ball(NULL, b, 8, &m); else cloth_mesh_disc(NULL, b, 4, &m);
        }
        if (!m) continue;
        for (int k = 0; k < 3 * m->nv; k++) bad += !isfinite(m->x[k]);
        for (int k = 0; m->X && k < 6 * m->nf; k++) bad += !isfinite(m->X[k]);
        taken++;
        cloth_mesh_destroy(NULL, m);
    }
    CHECK(bad == 0 && taken == 4 * 16 + 8 * 4);
}

static void generator_refusals(void) {
    host        h;
    cloth_hooks hooks = host_hooks(&h);
    cloth_mesh *m = NULL;
    const cloth_sheet_pattern g = CLOTH_SHEET_ALTERNATING;
    CHECK(cloth_mesh_sheet(&hooks, g, 1, 2, 1.0, 1.0, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "nx = 1") != NULL);
    CHECK(cloth_mesh_sheet(&hooks, g, 2, 0, 1.0, 1.0, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "ny = 0") != NULL);
    CHECK(cloth_mesh_sheet(&hooks, g, 2, 2, 0.0, 1.0, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "width = 0") != NULL);
    CHECK(cloth_mesh_sheet(&hooks, g, 2, 2, 1.0, HOST_NAN, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "height = NaN") != NULL);
    CHECK(cloth_mesh_sheet(&hooks, g, 50000, 50000, 1.0, 1.0, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_sheet(&hooks, (cloth_sheet_pattern)7, 2, 2, 1.0, 1.0, &m) ==
          CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "pattern = 7") != NULL);
    CHECK(cloth_mesh_sheet(&hooks, CLOTH_SHEET_EQUILATERAL, 9, 0, 1e-300, 1e300, &m) ==
          CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_tube(&hooks, -1.0, 1.0, 3, 2, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_tube(&hooks, 1.0, 1.0, 2, 2, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_tube(&hooks, 1.0, 1.0, 3, 1, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_tube(&hooks, 1.0, 1.0, 0x7fffffff, 0x7fffffff, &m) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_disc(&hooks, HOST_INFINITY, 2, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_disc(&hooks, 1.0, 0, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_disc(&hooks, 1.0, 1 << 30, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_mesh_sheet(&hooks, g, 2, 2, 1.0, 1.0, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_tube(&hooks, 1.0, 1.0, 3, 2, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_disc(&hooks, 1.0, 1, NULL) == CLOTH_ERR_ARGUMENT);
    h.fail_at = h.calls + 1;
    CHECK(cloth_mesh_disc(&hooks, 1.0, 3, &m) == CLOTH_ERR_MEMORY && !m);
    CHECK(h.live == 0);
}

/* --- check --- */

/* A 4 x 4 sheet to be spoilt. */
static cloth_mesh *sheet4(void) {
    cloth_mesh *m = NULL;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_DIAGONAL, 4, 4, 1.0, 1.0, &m) != CLOTH_OK) abort();
    return m;
}

/* The mesh has exactly n faults of the kind, the first at index, and says `text`. */
static void expect_fault(const cloth_mesh *m, const double *X, cloth_mesh_fault kind, int n,
                         int index, cloth_status status, const char *text) {
    host              h;
    cloth_hooks       hooks = host_hooks(&h);
    cloth_mesh_report r;
    int               k;
    CHECK(cloth_mesh_check(&hooks, m->nv, m->x, m->nf, m->faces, X, &r) == status);
    CHECK(h.live == 0);
    if (!CHECK(strstr(h.text, text) != NULL)) printf("wanted: %s\n%s", text, h.text);
    for (k = 0; k < CLOTH_MESH_FAULT_COUNT; k++) {
        if (!CHECK(r.count[k] == (k == (int)kind ? n : 0))) printf("kind %d: %d\n", k, r.count[k]);
        CHECK(r.first[k] == (k == (int)kind ? index : -1));
    }
    CHECK(r.errors + r.warnings == n && (status == CLOTH_OK) == (r.errors == 0));
}

static void check_every_fault(void) {
    cloth_mesh *m = sheet4();
    double      X[18 * 6], mid[2];
    int         f = 7, t[3], k;
    memcpy(t, m->faces + 3 * f, sizeof t);
    m->faces[3 * f + 1] = 16;
    expect_fault(m, NULL, CLOTH_MESH_INDEX, 1, f, CLOTH_ERR_MESH,
                 "face 7: corner 1 = 16 but nv = 16");
    m->faces[3 * f + 1] = -5;
    expect_fault(m, NULL, CLOTH_MESH_INDEX, 1, f, CLOTH_ERR_MESH, "face 7: corner 1 = -5");
    m->faces[3 * f + 1] = t[0];
    expect_fault(m, NULL, CLOTH_MESH_REPEATED, 1, f, CLOTH_ERR_MESH, "face 7: corners");
    memcpy(m->faces + 3 * f, t, sizeof t);

    m->x[3 * 5 + 2] = HOST_NAN;
    expect_fault(m, NULL, CLOTH_MESH_NONFINITE, 1, 17, CLOTH_ERR_NONFINITE,
                 "vertex 5: z is NaN");
    m->x[3 * 5 + 2] = -HOST_INFINITY;
    expect_fault(m, NULL, CLOTH_MESH_NONFINITE, 1, 17, CLOTH_ERR_NONFINITE,
                 "vertex 5: z is -inf");
    cloth_mesh_destroy(NULL, m);

    m = sheet4();
    m->x[0] = 0.5 * (m->x[3] + m->x[15]);       /* vertex 0 between vertices 1 and 5 */
    m->x[2] = 0.5 * (m->x[5] + m->x[17]);
    expect_fault(m, NULL, CLOTH_MESH_ZERO_AREA, 1, 0, CLOTH_ERR_MESH,
                 "face 0: corners 0 5 1 span no area");
    mid[0] = m->x[0], mid[1] = m->x[2];         /* and a little off: 1e-4 high, from either side */
    for (k = 0; k < 2; k++) {
        const double high = k ? 1.01e-4 : 0.99e-4;
        m->x[0] = mid[0] + high * (m->x[17] - m->x[5]);
        m->x[2] = mid[1] - high * (m->x[15] - m->x[3]);
        expect_fault(m, NULL, k ? CLOTH_MESH_FAULT_COUNT : CLOTH_MESH_SLIVER, !k, 0, CLOTH_OK,
                     k ? "" : "face 0: a sliver");
    }
    cloth_mesh_destroy(NULL, m);

    m = sheet4();                               /* without vertex 15 and its two faces */
    m->nv = 15;
    m->nf = 17;
    t[0] = m->faces[3 * 2 + 1];
    t[1] = m->faces[3 * 2 + 2];
    t[2] = m->faces[3 * 2];
    memcpy(m->faces + 3 * (m->nf - 1), t, sizeof t);
    expect_fault(m, NULL, CLOTH_MESH_DUPLICATE, 1, m->nf - 1, CLOTH_ERR_MESH,
                 "face 16 has the corners of face 2");
    t[0] = m->faces[3 * 2];
    t[1] = m->faces[3 * 2 + 2];
    t[2] = m->faces[3 * 2 + 1];
    memcpy(m->faces + 3 * (m->nf - 1), t, sizeof t);
    expect_fault(m, NULL, CLOTH_MESH_DUPLICATE, 1, m->nf - 1, CLOTH_ERR_MESH, "face 16 has");
    m->nf--;
    expect_fault(m, NULL, CLOTH_MESH_FAULT_COUNT, 0, 0, CLOTH_OK, "");
    m->nv++;
    expect_fault(m, NULL, CLOTH_MESH_ISOLATED, 1, 15, CLOTH_OK, "of the first corner's mass");
    cloth_mesh_destroy(NULL, m);

    m = sheet4();                               /* a fin on the edge 0-5 */
    memmove(m->x + 3 * 15, m->x, 3 * sizeof *m->x);
    m->x[3 * 15 + 1] = 0.4;
    m->faces[3 * 16] = 0;
    m->faces[3 * 16 + 1] = 5;
    m->faces[3 * 16 + 2] = 15;
    m->nf = 17;
    expect_fault(m, NULL, CLOTH_MESH_THREE_FACES, 1, 0, CLOTH_ERR_MESH,
                 "edge 0-5 has 3 faces, among them 0, 1 and 16");
    cloth_mesh_destroy(NULL, m);

    m = sheet4();
    t[0] = m->faces[3 * 17];
    m->faces[3 * 17] = m->faces[3 * 17 + 1];
    m->faces[3 * 17 + 1] = t[0];                /* a corner face: one edge with another face */
    expect_fault(m, NULL, CLOTH_MESH_ORIENTATION, 2, 14, CLOTH_ERR_MESH, "both run");
    cloth_mesh_destroy(NULL, m);

    m = sheet4();                               /* all but two opposite cells of the middle */
    memcpy(m->faces + 6, m->faces + 3 * 8, 6 * sizeof *m->faces);
    m->nf = 4;
    {
        host              h;
        cloth_hooks       hooks = host_hooks(&h);
        cloth_mesh_report r;
        CHECK(cloth_mesh_check(&hooks, m->nv, m->x, m->nf, m->faces, m->X, &r) == CLOTH_OK);
        CHECK(r.count[CLOTH_MESH_BOW_TIE] == 1 && r.first[CLOTH_MESH_BOW_TIE] == 5);
        CHECK(r.count[CLOTH_MESH_ISOLATED] == 9 && r.warnings == 10 && r.errors == 0);
        CHECK(strstr(h.text, "vertex 5 joins 2 surfaces") != NULL);
    }
    cloth_mesh_destroy(NULL, m);

    m = sheet4();
    memcpy(X, m->X, sizeof X);
    expect_fault(m, X, CLOTH_MESH_FAULT_COUNT, 0, 0, CLOTH_OK, "");
    X[6 * 3 + 2] = X[6 * 3];
    X[6 * 3 + 3] = X[6 * 3 + 1];
    expect_fault(m, X, CLOTH_MESH_PATTERN, 1, 3, CLOTH_ERR_MESH, "face 3 has no area");
    memcpy(X, m->X, sizeof X);
    for (f = 0; f < 3; f++) X[6 * 4 + 2 * f] *= -1;
    expect_fault(m, X, CLOTH_MESH_PATTERN, 1, 4, CLOTH_ERR_MESH, "face 4 is mirrored");
    for (f = 0; f < 6; f++) X[6 * 4 + f] *= 1e-100;
    expect_fault(m, X, CLOTH_MESH_PATTERN, 1, 4, CLOTH_ERR_MESH, "face 4 is mirrored");
    memcpy(X, m->X, sizeof X);
    X[6 * 4 + 3] = HOST_NAN;
    expect_fault(m, X, CLOTH_MESH_NONFINITE, 1, 3 * 16 + 6 * 4 + 3, CLOTH_ERR_NONFINITE,
                 "pattern: corner 1 of face 4: y is NaN");
    cloth_mesh_destroy(NULL, m);
}

/* faces left out before a copy do not shift the numbers that are named */
static void check_names_the_first_copy(void) {
    static const int  faces[] = {0, 0, 1, 0, 1, 2, 9, 1, 2, 1, 2, 0};
    host              h;
    cloth_hooks       hooks = host_hooks(&h);
    cloth_mesh_report r;
    CHECK(cloth_mesh_check(&hooks, 4, tetra_x, 4, faces, NULL, &r) == CLOTH_ERR_MESH);
    CHECK(r.first[CLOTH_MESH_REPEATED] == 0 && r.first[CLOTH_MESH_INDEX] == 2);
    CHECK(r.first[CLOTH_MESH_DUPLICATE] == 3 && r.errors == 3);
    CHECK(strstr(h.text, "face 3 has the corners of face 1") != NULL);
}

static void check_limits_the_log(void) {
    host              h;
    cloth_hooks       hooks = host_hooks(&h);
    cloth_mesh_report r;
    cloth_mesh       *m = NULL;
    int               f;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_DIAGONAL, 40, 40, 1.0, 1.0, &m) == CLOTH_OK);
    for (f = 0; f < m->nf; f++) m->faces[3 * f] = 1000000 + f;
    CHECK(cloth_mesh_check(&hooks, m->nv, m->x, m->nf, m->faces, NULL, &r) == CLOTH_ERR_MESH);
    CHECK(r.count[CLOTH_MESH_INDEX] == m->nf && r.errors == m->nf);
    CHECK(h.lines <= 2 * (CLOTH_MESH_FAULTS_LOGGED + 1));
    CHECK(strstr(h.text, "index out of range: 3042 in all, 3032 not listed") != NULL);
    cloth_mesh_destroy(NULL, m);
}

static void check_refusals(void) {
    host              h;
    cloth_hooks       hooks;
    cloth_mesh_report r;
    int               fail;
    hooks = host_hooks(&h);
    CHECK(cloth_mesh_check(&hooks, 4, NULL, 4, tetra, NULL, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_check(&hooks, 4, tetra_x, 4, NULL, NULL, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_check(&hooks, -4, tetra_x, 4, tetra, NULL, &r) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_check(&hooks, 4, tetra_x, 0x7fffffff, tetra, NULL, &r) ==
          CLOTH_ERR_ARGUMENT);
    CHECK(cloth_mesh_check(&hooks, 0, tetra_x, 0, tetra, NULL, &r) == CLOTH_ERR_MESH);
    CHECK(cloth_mesh_check(&hooks, 4, tetra_x, 0, tetra, NULL, &r) == CLOTH_ERR_MESH);
    CHECK(h.live == 0 && h.errors == 6 && r.errors == 0);
    CHECK(cloth_mesh_check(NULL, 4, tetra_x, 4, tetra, NULL, NULL) == CLOTH_OK);
    for (fail = 1;; fail++) {
        cloth_status status;
        hooks = host_hooks(&h);
        h.fail_at = fail;
        status = cloth_mesh_check(&hooks, 4, tetra_x, 4, tetra, NULL, &r);
        CHECK(h.live == 0);
        if (status == CLOTH_OK) break;
        CHECK(status == CLOTH_ERR_MEMORY && h.errors == 1);
    }
    CHECK(fail == 3);
}

/* coordinates near the largest double: no overflow inside, a defined answer */
static void check_extreme_sizes(void) {
    static const double scales[] = {1e-300, 1e-160, 1e-5, 1e5, 1e160, 5e307};
    size_t              i;
    int                 k;
    for (i = 0; i < sizeof scales / sizeof *scales; i++) {
        double x[12];
        for (k = 0; k < 12; k++) x[k] = tetra_x[k] * scales[i];
        CHECK(cloth_mesh_check(NULL, 4, x, 4, tetra, NULL, NULL) == CLOTH_OK);
        for (k = 0; k < 12; k++) x[k] = k % 3 ? 0 : (k - 4) * (scales[i] / 8);
        CHECK(cloth_mesh_check(NULL, 4, x, 4, tetra, NULL, NULL) == CLOTH_ERR_MESH);
        for (k = 0; k < 12; k++) x[k] = (2 * tetra_x[k] - 1) * 1.7e308;     /* edges overflow */
        CHECK(cloth_mesh_check(NULL, 4, x, 4, tetra, NULL, NULL) == CLOTH_ERR_MESH);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(topology_tetrahedron);
    RUN(topology_fold_sign);
    RUN(topology_annulus);
    RUN(topology_bow_tie);
    RUN(topology_refusals);
    RUN(topology_failing_allocator);
    RUN(weld_failing_allocator);
    RUN(topology_million_faces_on_a_vertex);
    RUN(generator_sheets);
    RUN(generator_alternating_layout);
    RUN(generator_equilateral_edges);
    RUN(generator_tube);
    RUN(generator_disc);
    RUN(generator_merge);
    RUN(generator_merge_render_corners);
    RUN(generator_merge_checks);
    RUN(orient_beside_edges_of_many_faces);
    RUN(generator_ball_equator);
    RUN(edges_of_c);
    RUN(half_an_allocator);
    RUN(generator_box_refusals);
    RUN(generator_sizes);
    RUN(generator_refusals);
    RUN(check_every_fault);
    RUN(check_names_the_first_copy);
    RUN(check_limits_the_log);
    RUN(check_refusals);
    RUN(check_extreme_sizes);
    return TEST_END();
}
