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
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, m);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(set_mesh);
    RUN(warns);
    RUN(save_obj);
    RUN(statuses);
    RUN(log_stderr);
    return TEST_END();
}
