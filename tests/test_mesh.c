/* test_mesh.c - topology, mesh check, generators.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_mesh.c -o test_mesh -lm && ./test_mesh */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include "test.h"

/* --- an allocator that counts and fails on request, a logger that collects --- */

typedef struct host {
    int  live, calls, fail_at;
    int  lines, errors;
    char text[65536];
    int  n;
} host;

static void *host_alloc(size_t size, void *user) {
    host *h = (host *)user;
    void *p;
    if (++h->calls == h->fail_at) return NULL;
    p = malloc(size);
    h->live += p != NULL;
    return p;
}

static void host_free(void *p, size_t size, void *user) {
    (void)size;
    ((host *)user)->live -= p != NULL;
    free(p);
}

static void host_log(cloth_log_level level, cloth_status status, const char *text, void *user) {
    host *h = (host *)user;
    int   n = (int)strlen(text);
    (void)status;
    h->lines++;
    h->errors += level == CLOTH_LOG_ERROR;
    if (h->n + n + 2 > (int)sizeof h->text) return;
    memcpy(h->text + h->n, text, (size_t)n);
    h->n += n;
    h->text[h->n++] = '\n';
    h->text[h->n] = '\0';
}

static cloth_hooks host_hooks(host *h) {
    cloth_hooks hooks;
    memset(h, 0, sizeof *h);
    memset(&hooks, 0, sizeof hooks);
    hooks.allocator.alloc = host_alloc;
    hooks.allocator.free = host_free;
    hooks.allocator.user = h;
    hooks.log.fn = host_log;
    hooks.log.user = h;
    return hooks;
}

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
        {3, 2, {0, 1, 2, 0, 2, 1}, CLOTH_ERR_MESH, "faces 0 and 1 have the same corners"},
        {3, 2, {0, 1, 2, 1, 2, 0}, CLOTH_ERR_MESH, "faces 0 and 1 both run"},
        {3, 1, {0, 1, 3}, CLOTH_ERR_MESH, "faces[0] corner 2 = 3 but nv = 3"},
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
    CHECK(fail > 3);
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

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(topology_tetrahedron);
    RUN(topology_fold_sign);
    RUN(topology_annulus);
    RUN(topology_bow_tie);
    RUN(topology_refusals);
    RUN(topology_failing_allocator);
    RUN(topology_million_faces_on_a_vertex);
    return TEST_END();
}
