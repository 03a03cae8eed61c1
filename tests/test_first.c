/* test_first.c - what a first program calls: a mesh into a desc, a log on stderr, the sim as OBJ,
 * what is warned of, and statuses that say what to do without a log hook.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_first.c -o test_first -lm
 */
#include "clothsim_collide.h"
#include "test.h"

static char said[2000];
static int  warnings;

static void note(cloth_log_level level, cloth_status status, const char *text, void *user) {
    (void)status;
    (void)user;
    warnings += level == CLOTH_LOG_WARNING;
    snprintf(said, sizeof said, "%s", text);
}

static cloth_mesh *sheet(double size) {
    cloth_mesh *m = NULL;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 6, 6, size, size, &m) == CLOTH_OK);
    return m;
}

/* Makes the model of a desc and says how many warnings came. */
static int warned(cloth_desc *desc) {
    cloth_model *model = NULL;
    desc->hooks.log.fn = note;
    warnings = 0, said[0] = 0;
    CHECK(cloth_model_create(desc, &model) == CLOTH_OK);
    cloth_model_destroy(model);
    return warnings;
}

static void set_mesh(void) {
    cloth_mesh  *m = sheet(1);
    cloth_desc   a = cloth_desc_default(), b = a;
    cloth_model *ma = NULL, *mb = NULL;
    a.nv = m->nv, a.x_rest = m->x, a.nf = m->nf, a.faces = m->faces, a.X = m->X;
    cloth_desc_set_mesh(&b, m);
    cloth_desc_set_mesh(NULL, m), cloth_desc_set_mesh(&b, NULL);
    CHECK(b.part == NULL && b.X == m->X);
    CHECK(!cloth_model_create(&a, &ma) && !cloth_model_create(&b, &mb));
    CHECK(cloth_model_hash(ma) == cloth_model_hash(mb));
    cloth_model_destroy(ma), cloth_model_destroy(mb), cloth_mesh_destroy(NULL, m);
}

static void warns(void) {
    cloth_mesh *m = sheet(1), *large = sheet(70), *small_one = sheet(0.005);
    cloth_desc  d = cloth_desc_default(), soup = d;
    double      x[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    int         faces[6] = {0, 1, 2, 3, 4, 5};
    cloth_desc_set_mesh(&d, m);
    CHECK(warned(&d) == 0);
    d.wind[0] = 3;
    CHECK(warned(&d) == 1 && strstr(said, "wind_on"));
    d.wind_on = 1;
    CHECK(warned(&d) == 0);
    cloth_desc_set_mesh(&d, large);
    CHECK(warned(&d) == 1 && strstr(said, "has 4900 m^2"));
    cloth_desc_set_mesh(&d, small_one);
    CHECK(warned(&d) == 1 && strstr(said, "metre"));
    soup.nv = 6, soup.x_rest = x, soup.nf = 2, soup.faces = faces;
    CHECK(warned(&soup) == 1 && strstr(said, "weld"));
    soup.nf = 1, soup.nv = 3;
    CHECK(warned(&soup) == 0);
    cloth_mesh_destroy(NULL, m), cloth_mesh_destroy(NULL, large);
    cloth_mesh_destroy(NULL, small_one);
}

static void save_obj(void) {
    const char  *path = "out/test_first.obj";
    cloth_mesh  *m = sheet(1), *back = NULL;
    cloth_desc   d = cloth_desc_default();
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    FILE        *file = fopen(path, "wb");
    if (file) fclose(file);
    else path = "test_first.obj";
    cloth_desc_set_mesh(&d, m);
    CHECK(!cloth_model_create(&d, &model) && !cloth_sim_create(model, &sim));
    CHECK(cloth_step(sim, 1.0 / 60, NULL) == CLOTH_OK);
    CHECK(cloth_sim_save_obj(NULL, path) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_sim_save_obj(sim, path) == CLOTH_OK);
    CHECK(cloth_obj_load(NULL, path, NULL, &back) == CLOTH_OK);
    CHECK(back && back->nv == m->nv && back->nf == m->nf &&
          !memcmp(back->x, cloth_sim_state(sim)->x, 3 * sizeof(double) * (size_t)m->nv) &&
          !memcmp(back->faces, m->faces, 3 * sizeof(int) * (size_t)m->nf));
    remove(path);
    cloth_mesh_destroy(NULL, back), cloth_sim_destroy(sim), cloth_model_destroy(model);
    cloth_mesh_destroy(NULL, m);
}

/* Six times the volume of a closed mesh, or what a closed one has not: an edge with one face. */
static double volume6(const cloth_mesh *m) {
    cloth_topology *t = NULL;
    double          sum = 0;
    int             f, e;
    if (cloth_topology_create(NULL, m->nv, m->nf, m->faces, &t)) return 0;
    for (e = 0; e < t->ne; e++) CHECK(t->edge_faces[2 * e + 1] >= 0);
    for (f = 0; f < m->nf; f++) {
        const double *a = m->x + 3 * m->faces[3 * f], *b = m->x + 3 * m->faces[3 * f + 1];
        const double *c = m->x + 3 * m->faces[3 * f + 2];
        sum += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    CHECK(m->nv - t->ne + m->nf == 2);
    cloth_topology_destroy(NULL, t);
    return sum;
}

/* volumes: of the box exactly; of a cylinder's prism; of a ball nearly */
static void closed_meshes(void) {
    static const double size[3] = {0.3, 2, 0.7};
    static const int    around[4] = {3, 4, 5, 64};
    cloth_mesh         *m = NULL;
    int                 k;
    CHECK(cloth_mesh_box(NULL, size, &m) == CLOTH_OK);
    CHECK_REL(volume6(m), 6 * 0.3 * 2 * 0.7, 1e-14);
    for (k = 0; k < 3 * m->nv; k++)
        CHECK(fabs(m->x[k]) == 0.5 * size[k % 3] || (k / 3 % 9 == 0 && fabs(m->x[k]) <= 1));
    cloth_mesh_destroy(NULL, m);
    for (k = 0; k < 4; k++) {
        const double n = around[k], pi = 3.14159265358979323846;
        CHECK(cloth_mesh_cylinder(NULL, 0.4, 1.5, around[k], &m) == CLOTH_OK);
        CHECK_REL(volume6(m), 6 * 1.5 * 0.16 * 0.5 * n * sin(2 * pi / n), 1e-13);
        cloth_mesh_destroy(NULL, m);
        CHECK(cloth_mesh_ball(NULL, 0.4, around[k], &m) == CLOTH_OK);
        CHECK(volume6(m) > 0 && (k < 3 || fabs(volume6(m) / (8 * pi * 0.064) - 1) < 0.01));
        for (int i = 0; i < m->nv; i++)
            CHECK_NEAR(hypot(hypot(m->x[3 * i], m->x[3 * i + 1]), m->x[3 * i + 2]), 0.4, 1e-15);
        cloth_mesh_destroy(NULL, m);
    }
    CHECK(cloth_mesh_ball(NULL, 0, 8, &m) == CLOTH_ERR_ARGUMENT && m == NULL);
    CHECK(cloth_mesh_ball(NULL, 1, 2, &m) == CLOTH_ERR_ARGUMENT && m == NULL);
    CHECK(cloth_mesh_box(NULL, NULL, &m) == CLOTH_ERR_ARGUMENT);
}

/* A mesh taken apart, each face with corners of its own, moved by up to `noise` in x, every third
 * face turned. */
static cloth_mesh *soup_of(const cloth_mesh *m, double noise) {
    cloth_mesh    s = *m, *out = NULL, *list[1];
    double       *x = (double *)malloc(9 * sizeof *x * (size_t)m->nf);
    int          *faces = (int *)malloc(3 * sizeof *faces * (size_t)m->nf);
    for (int c = 0; c < 3 * m->nf; c++) {
        const int turned = c / 3 % 3 == 0 && c % 3 > 0;
        faces[c] = turned ? c - c % 3 + 3 - c % 3 : c;
        memcpy(x + 3 * c, m->x + 3 * m->faces[c], 3 * sizeof *x);
        x[3 * c] += noise * (c % 7 - 3) / 3;
    }
    s.nv = 3 * m->nf, s.x = x, s.faces = faces, s.X = NULL, s.part = NULL, s.nr = 0;
    list[0] = &s;
    CHECK(cloth_mesh_merge(NULL, list, 1, &out) == CLOTH_OK);       /* a copy in a block */
    free(x), free(faces);
    return out;
}

static void weld_and_orient(void) {
    cloth_mesh *ball = NULL, *soup, *w = NULL, *m = sheet(1);
    double     *X;
    int         turned = -1, a[3];
    CHECK(cloth_mesh_ball(NULL, 0.4, 16, &ball) == CLOTH_OK);
    soup = soup_of(ball, 1e-7);
    CHECK(cloth_mesh_weld(NULL, soup, 1e-9, &w) == CLOTH_OK && w->nv > 2 * ball->nv);
    cloth_mesh_destroy(NULL, w);
    CHECK(cloth_mesh_weld(NULL, soup, 1e-6, &w) == CLOTH_OK);
    CHECK(w->nv == ball->nv && w->nf == ball->nf && w->part && w->npart == 1);
    CHECK(cloth_mesh_orient(NULL, w, &turned) == CLOTH_OK && turned == (ball->nf + 2) / 3);
    CHECK_NEAR(volume6(w), volume6(ball), 1e-6);
    CHECK(cloth_mesh_orient(NULL, w, &turned) == CLOTH_OK && turned == 0);
    cloth_mesh_destroy(NULL, w);
    CHECK(cloth_mesh_weld(NULL, soup, 0.1, &w) == CLOTH_OK && w->nf < ball->nf);
    cloth_mesh_destroy(NULL, w);
    CHECK(cloth_mesh_weld(NULL, soup, 0, &w) == CLOTH_ERR_ARGUMENT && w == NULL);
    for (int f = 0; f < ball->nf; f++) {            /* inside out: all turned */
        int *t = ball->faces + 3 * f, k = t[0];
        t[0] = t[1], t[1] = k;
    }
    CHECK(cloth_mesh_orient(NULL, ball, &turned) == CLOTH_OK && turned == ball->nf);
    CHECK(volume6(ball) > 0);
    /* one face of a sheet turned: turned back, and its pattern is a mirror image, not negative */
    X = m->X + 6 * 7, memcpy(a, m->faces + 21, sizeof a);
    m->faces[21] = a[0], m->faces[22] = a[2], m->faces[23] = a[1];
    CHECK(cloth_mesh_check(NULL, m->nv, m->x, m->nf, m->faces, NULL, NULL) == CLOTH_ERR_MESH);
    for (int k = 0; k < 6; k += 2) X[k] = -X[k];
    for (int k = 2; k < 4; k++) { const double u = X[k]; X[k] = X[k + 2], X[k + 2] = u; }
    CHECK(cloth_mesh_orient(NULL, m, &turned) == CLOTH_OK && turned == 1);
    CHECK(!memcmp(a, m->faces + 21, sizeof a));
    CHECK(cloth_mesh_check(NULL, m->nv, m->x, m->nf, m->faces, m->X, NULL) == CLOTH_OK);
    {   /* five triangles around a Moebius strip */
        double     x[15] = {1,0,0, 2,1,0, 0,2,0, -2,1,1, -1,0,0};
        int        faces[15] = {0,1,2, 1,2,3, 2,3,4, 3,4,0, 4,0,1};
        cloth_mesh strip;
        memset(&strip, 0, sizeof strip);
        strip.nv = strip.nf = 5, strip.x = x, strip.faces = faces;
        CHECK(cloth_mesh_orient(NULL, &strip, &turned) == CLOTH_ERR_MESH && turned == 0);
        CHECK(faces[4] == 2);
    }
    cloth_mesh_destroy(NULL, w), cloth_mesh_destroy(NULL, soup), cloth_mesh_destroy(NULL, ball);
    cloth_mesh_destroy(NULL, m);
}

/* Squared length of the side of a face's pattern from corner i to j. */
static double side2(const double *X, int i, int j) {
    const double u = X[2 * i] - X[2 * j], v = X[2 * i + 1] - X[2 * j + 1];
    return u * u + v * v;
}

/* The pattern of a face that is turned keeps its lengths, wherever it lies. */
static void turned_pattern(void) {
    cloth_mesh *m = sheet(1);
    double     *X = m->X + 6 * 7, was[6];
    int         k = m->faces[22], turned = -1;
    m->faces[22] = m->faces[23], m->faces[23] = k;
    for (k = 0; k < 6; k += 2) X[k] += 0.5;
    memcpy(was, X, sizeof was);
    CHECK(cloth_mesh_orient(NULL, m, &turned) == CLOTH_OK && turned == 1);
    CHECK_NEAR(side2(X, 0, 1), side2(was, 0, 2), 1e-15);
    CHECK_NEAR(side2(X, 0, 2), side2(was, 0, 1), 1e-15);
    CHECK_NEAR(side2(X, 1, 2), side2(was, 2, 1), 1e-15);
    cloth_mesh_destroy(NULL, m);
}

/* A face that welding takes away takes its part along; those behind it keep theirs. */
static void weld_keeps_parts(void) {
    double     x[15] = {0,0,0, 1,0,0, 0,1,0, 1e-4,1,0, 1,1,0};
    int        faces[9] = {0,1,2, 2,1,3, 3,1,4}, part[3] = {0, 1, 2};
    cloth_mesh m, *w = NULL;
    memset(&m, 0, sizeof m);
    m.nv = 5, m.nf = 3, m.x = x, m.faces = faces, m.part = part, m.npart = 3;
    CHECK(cloth_mesh_weld(NULL, &m, 1e-3, &w) == CLOTH_OK && w->nv == 4 && w->nf == 2);
    CHECK(w->part[0] == 0 && w->part[1] == 2 && w->npart == 3);
    cloth_mesh_destroy(NULL, w);
}

/* A face that is turned takes its corners of texture along. */
static void orient_textured(void) {
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nvt 0 0\nvt 1 0\n"
        "vt 1 1\nvt 0 1\nvt 3 3\nf 1/1 2/2 3/3\nf 1/5 3/3 4/4\nf 2/2 3/5 5/1\n";
    cloth_mesh       *m = NULL;
    int               turned = 0;
    CHECK(cloth_obj_parse(NULL, text, sizeof text - 1, NULL, &m) == CLOTH_OK && m->nr == 7);
    CHECK(cloth_mesh_orient(NULL, m, &turned) == CLOTH_OK && turned == 1);
    for (int k = 0; k < 9; k++) CHECK(m->render_vertex[m->render_faces[k]] == m->faces[k]);
    CHECK(m->faces[7] == 4 && m->vt[2 * m->render_faces[7]] < 0.5);     /* vertex 5, vt 0 0 */
    cloth_mesh_destroy(NULL, m);
}

/* An open piece looks as most of its faces do, whichever comes first. */
static void orient_by_majority(void) {
    cloth_mesh *m = sheet(1);
    int         f, k, turned = -1;
    for (f = 3; f < m->nf; f++) {
        k = m->faces[3 * f + 1];
        m->faces[3 * f + 1] = m->faces[3 * f + 2], m->faces[3 * f + 2] = k;
    }
    CHECK(cloth_mesh_orient(NULL, m, &turned) == CLOTH_OK && turned == 3);
    cloth_mesh_destroy(NULL, m);
}

/* parts are numbered by their first faces, whatever was named before; names go with them */
static void part_names(void) {
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\n"
        "g empty\ng back  panel \nusemtl denim\nf 2 4 3\ng sleeve\nf 1 4 3\n"
        "usemtl silk\ng back  panel\nf 1 2 4\n";
    static const int  part[3][4] = {{0, 0, 0, 0}, {0, 1, 2, 1}, {0, 1, 1, 2}};
    static const char group[] = "\0back  panel\0sleeve", material[] = "\0denim\0silk";
    for (int k = 0; k < 3; k++) {
        cloth_obj_options o = cloth_obj_options_default();
        cloth_mesh       *m = NULL;
        o.parts = k == 0 ? CLOTH_OBJ_PARTS_OBJECTS
                : k == 1 ? CLOTH_OBJ_PARTS_GROUPS : CLOTH_OBJ_PARTS_MATERIALS;
        CHECK(cloth_obj_parse(NULL, text, sizeof text - 1, &o, &m) == CLOTH_OK);
        CHECK(m->npart == (k ? 3 : 1) && !memcmp(m->part, part[k], sizeof part[k]));
        CHECK(k != 0 || m->names[0] == 0);
        CHECK(k != 1 || !memcmp(m->names, group, sizeof group));
        CHECK(k != 2 || !memcmp(m->names, material, sizeof material));
        cloth_mesh_destroy(NULL, m);
    }
}

/* stderr goes into a file for this test, the last of the program */
static void log_stderr(void) {
    char   text[300];
    size_t n;
    FILE  *file = freopen("out/test_first.log", "w+", stderr);
    if (!file) SKIP("stderr cannot be led into a file here");
    cloth_log_stderr(CLOTH_LOG_ERROR, CLOTH_ERR_MESH, "face 4 is missing", NULL);
    cloth_log_stderr(CLOTH_LOG_WARNING, CLOTH_OK, "odd", NULL);
    fflush(file);
    rewind(file);
    n = fread(text, 1, sizeof text - 1, file);
    text[n] = 0;
    CHECK(strstr(text, "error: face 4 is missing (the mesh") == text);
    CHECK(strstr(text, "\nwarning: odd (ok)\n") != NULL);
    remove("out/test_first.log");
}

/* without a log hook the sentence of the status has to lead on */
static void statuses(void) {
    cloth_mesh    *m = sheet(1);
    cloth_desc     d = cloth_desc_default();
    cloth_model   *model = NULL;
    cloth_sim     *sim = NULL;
    cloth_collide *c = NULL;
    cloth_status   status;
    cloth_desc_set_mesh(&d, m);
    CHECK(!cloth_model_create(&d, &model) && !cloth_sim_create(model, &sim));
    status = cloth_collide_create(sim, NULL, &c);
    CHECK(strstr(cloth_status_text(status), "desc.contact") != NULL);
    status = cloth_solve_static(sim, NULL);
    CHECK(status != CLOTH_OK && strstr(cloth_status_text(status), "pinned") != NULL);
    CHECK(strstr(cloth_status_text(status), "shorter h") != NULL);      /* where contact fails */
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, m);
}

/* A closed obstacle whose faces look inwards is taken, as a room, and said to be one; a ball with a
 * hollow in it, whose inner faces look inwards as they should, is not. */
static void inside_out(void) {
    cloth_mesh         *m = sheet(0.2), *ball = NULL, *hollow = NULL, *both = NULL;
    cloth_mesh         *pair[2];
    cloth_desc          d = cloth_desc_default();
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *c = NULL;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    int                 turn, i, k;
    CHECK(cloth_mesh_ball(NULL, 1.0, 12, &ball) == CLOTH_OK);
    CHECK(cloth_mesh_ball(NULL, 0.5, 12, &hollow) == CLOTH_OK);
    for (i = 0; i < hollow->nf; i++)
        k = hollow->faces[3 * i], hollow->faces[3 * i] = hollow->faces[3 * i + 1],
        hollow->faces[3 * i + 1] = k;
    pair[0] = ball, pair[1] = hollow;
    CHECK(cloth_mesh_merge(NULL, pair, 2, &both) == CLOTH_OK);
    cloth_desc_set_mesh(&d, m);
    d.contact = CLOTH_CONTACT_OBSTACLES;
    d.hooks.log.fn = note;
    CHECK(cloth_model_create(&d, &model) == CLOTH_OK);
    CHECK(cloth_sim_create(model, &sim) == CLOTH_OK);
    CHECK(cloth_collide_create(sim, NULL, &c) == CLOTH_OK);
    for (turn = 0; turn < 3; turn++) {
        const cloth_mesh *q = turn == 0 ? ball : turn == 1 ? hollow : both;
        for (i = 0; i < q->nv; i++) q->x[3 * i + 1] += 3;      /* clear of the cloth */
        o.nv = q->nv, o.nf = q->nf, o.x = q->x, o.faces = q->faces;
        warnings = 0;
        CHECK(cloth_collide_add(c, &o, NULL) == CLOTH_OK);
        CHECK(warnings == (turn == 1));
        if (turn == 1) CHECK(strstr(said, "looks inwards") != NULL);
    }
    cloth_collide_destroy(c), cloth_sim_destroy(sim), cloth_model_destroy(model);
    cloth_mesh_destroy(NULL, both), cloth_mesh_destroy(NULL, hollow);
    cloth_mesh_destroy(NULL, ball), cloth_mesh_destroy(NULL, m);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(set_mesh);
    RUN(warns);
    RUN(save_obj);
    RUN(statuses);
    RUN(closed_meshes);
    RUN(weld_and_orient);
    RUN(orient_textured);
    RUN(turned_pattern);
    RUN(weld_keeps_parts);
    RUN(orient_by_majority);
    RUN(part_names);
    RUN(log_stderr);
    RUN(inside_out);
    return TEST_END();
}
