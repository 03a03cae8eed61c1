/* test_desc.c - every refusal of cloth_model_create: the status, a sentence that names field and
 * value, *out NULL and nothing left allocated; hard but legal input is answered quickly.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_desc.c -o test_desc -lm \
 *      && ./test_desc */
#include "clothsim.h"
#include "test.h"
#include "scene.h"

static host        told;
static scene       sheet;
static cloth_hooks hooks;

/* A good desc whose hooks listen; the test spoils one field. */
static cloth_desc good(void) {
    scene_close(&sheet);
    hooks = host_hooks(&told);
    scene_desc(&sheet, 4, &hooks, 0);
    return sheet.desc;
}

/* The desc is refused with the status; a sentence holds both words ("" for any). */
static int refused(const cloth_desc *d, cloth_status want, const char *word, const char *value) {
    cloth_model *m = (cloth_model *)&told;
    cloth_status got;
    host_forget(&told);
    got = cloth_model_create(d, &m);
    if (got == want && !m && told.live == 0 && strstr(told.text, word) &&
        strstr(told.text, value) && (told.errors > 0) == (*word != '\0'))
        return 1;
    printf("  got %d (%s), out %p, live %d, said: %s\n", (int)got, cloth_status_text(got),
           (void *)m, told.live, told.text);
    if (m && got == CLOTH_OK) cloth_model_destroy(m);
    return 0;
}

static void accepted_and_freed(void) {
    cloth_desc   d = good();
    cloth_model *m = NULL;
    CHECK(cloth_model_create(&d, &m) == CLOTH_OK);
    CHECK(m != NULL && told.live > 0 && told.errors == 0);
    cloth_model_destroy(m);
    CHECK(told.live == 0);
    cloth_model_destroy(NULL);
    cloth_sim_destroy(NULL);
}

static void null_and_cookie(void) {
    cloth_desc   d = good();
    cloth_model *m = (cloth_model *)&d;
    cloth_sim   *s = (cloth_sim *)&d;
    CHECK(cloth_model_create(NULL, &m) == CLOTH_ERR_ARGUMENT && !m);
    host_forget(&told);
    CHECK(cloth_model_create(&d, NULL) == CLOTH_ERR_ARGUMENT && told.errors == 1);
    CHECK(cloth_sim_create(NULL, &s) == CLOTH_ERR_ARGUMENT && !s);
    d.cookie ^= 1u;
    CHECK(refused(&d, CLOTH_ERR_UNINIT, "", ""));
    memset(&d, 0, sizeof d);
    CHECK(refused(&d, CLOTH_ERR_UNINIT, "", ""));
}

static void bad_hooks(void) {
    cloth_desc d = good();
    d.hooks.allocator.free = NULL;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.hooks.allocator", "free"));
    d = good();
    d.hooks.parallel.run = (void (*)(void *, int, int, cloth_range_fn *, void *))(uintptr_t)1;
    d.hooks.parallel.max_workers = 0;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "max_workers", "0"));
}

static void bad_counts(void) {
    cloth_desc d;
    static const int wrong[] = {-1, 0, 2, CLOTH_MAX_COUNT + 1};
    char value[32];
    int  i;
    for (i = 0; i < 4; i++) {
        snprintf(value, sizeof value, "= %d", wrong[i]);
        d = good();
        d.nv = wrong[i];
        CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.nv", value));
        d = good();
        if (wrong[i] == 2) continue;
        d.nf = wrong[i];
        CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.nf", value));
    }
    d = good();
    d.x_rest = NULL;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.x_rest", "NULL"));
    d = good();
    d.faces = NULL;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.faces", "NULL"));
}

/* One number of every array becomes NaN, then inf. */
static void nonfinite_arrays(void) {
    static const char *const name[5] = {"vertex 2: y", "desc.x[", "desc.v[", "vertex_mass[",
                                        "pattern"};
    const double  bad[2] = {NAN, INFINITY};
    const char   *spelt[2] = {"NaN", "inf"};
    int           a, k, n;
    for (a = 0; a < 5; a++)
        for (k = 0; k < 2; k++) {
            cloth_desc d = good();
            double    *copy;
            n = a == 4 ? 6 * d.nf : a == 3 ? d.nv : 3 * d.nv;
            copy = (double *)malloc((size_t)n * sizeof(double));
            if (a == 4) memcpy(copy, sheet.mesh->X, (size_t)n * sizeof(double));
            else if (a == 3) { int i; for (i = 0; i < n; i++) copy[i] = 1; }
            else memcpy(copy, d.x_rest, (size_t)n * sizeof(double));
            copy[7] = bad[k];
            if (a == 0) d.x_rest = copy;
            if (a == 1) d.x = copy;
            if (a == 2) d.v = copy;
            if (a == 3) d.vertex_mass = copy;
            if (a == 4) d.X = copy;
            CHECK(refused(&d, CLOTH_ERR_NONFINITE, name[a], spelt[k]));
            free(copy);
        }
}

static void bad_mass(void) {
    cloth_desc d = good();
    double     mass[64];
    int        i;
    for (i = 0; i < 64; i++) mass[i] = 0.1;
    d.vertex_mass = mass;
    mass[3] = 0;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.vertex_mass[3]", "0"));
    mass[3] = -2.5;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.vertex_mass[3]", "-2.5"));
}

static void bad_faces(void) {
    cloth_desc d = good();
    int        faces[300];
    memcpy(faces, d.faces, 3 * (size_t)d.nf * sizeof(int));
    d.faces = faces;
    faces[5] = 907;
    CHECK(refused(&d, CLOTH_ERR_MESH, "907", "face 1"));
    faces[5] = -1;
    CHECK(refused(&d, CLOTH_ERR_MESH, "-1", "face 1"));
    faces[5] = faces[4];
    CHECK(refused(&d, CLOTH_ERR_MESH, "repeat", "face 1"));
    memcpy(faces, d.faces == faces ? sheet.mesh->faces : d.faces, 3 * (size_t)d.nf * sizeof(int));
    memcpy(faces + 6, faces + 3, 3 * sizeof(int));
    CHECK(refused(&d, CLOTH_ERR_MESH, "face 2", "face 1"));
}

/* Legal doubles whose areas are not. */
static void sizes_beyond_doubles(void) {
    static const double scale[2] = {1e-160, 1e160};
    int k, i;
    for (k = 0; k < 2; k++) {
        cloth_desc d = good();
        double    *x = (double *)malloc(3 * (size_t)d.nv * sizeof(double));
        for (i = 0; i < 3 * d.nv; i++) x[i] = scale[k] * d.x_rest[i];
        d.x_rest = x;
        CHECK(refused(&d, CLOTH_ERR_MESH, "rest area", k ? "inf" : "triangle 0"));
        free(x);
    }
}

static void bad_part_and_region(void) {
    cloth_desc     d = good();
    int            tag[100] = {0};
    cloth_material two[2];
    d.part = tag;
    tag[4] = -1;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.part[4]", "-1"));
    tag[4] = d.nf;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.part[4]", "is outside 0 .. "));
    d = good();
    d.region = tag;
    tag[4] = 1;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.region[4]", "1"));
    two[0] = two[1] = d.material;
    d.nregions = 2;
    d.materials = two;
    tag[4] = 2;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.region[4] = 2", "is outside 0 .. 1"));
    tag[4] = -3;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.region[4]", "-3"));
    tag[4] = 1;
    two[1].density = 0;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "[1].density", "0"));
    d.materials = NULL;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.materials", "NULL"));
    d.nregions = -1;
    d.materials = two;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.nregions", "-1 must be 0 to "));
}

static void bad_material(void) {
    static const struct { const char *name; size_t at; double value; const char *text; int inf; }
    row[] = {
        {"density", offsetof(cloth_material, density), 0, "0", 0},
        {"density", offsetof(cloth_material, density), -0.5, "-0.5", 0},
        {"density", offsetof(cloth_material, density), 1e-322, "masses of 0 kg", 0},
        {"density", offsetof(cloth_material, density), NAN, "NaN", 1},
        {"young", offsetof(cloth_material, young), -1, "-1", 0},
        {"young", offsetof(cloth_material, young), INFINITY, "inf", 1},
        {"thickness", offsetof(cloth_material, thickness), -1e-3, "-0.001", 0},
        {"membrane", offsetof(cloth_material, membrane), -5, "-5", 0},
        {"membrane", offsetof(cloth_material, membrane), NAN, "NaN", 1},
        {"poisson", offsetof(cloth_material, poisson), 0.6, "0.6", 0},
        {"poisson", offsetof(cloth_material, poisson), -1, "-1", 0},
        {"bending", offsetof(cloth_material, bending), NAN, "NaN", 1},
        {"damping", offsetof(cloth_material, damping), -1e-3, "-0.001", 0},
        {"damping", offsetof(cloth_material, damping), NAN, "NaN", 1}};
    size_t i;
    for (i = 0; i < sizeof row / sizeof *row; i++) {
        cloth_desc d = good();
        memcpy((char *)&d.material + row[i].at, &row[i].value, sizeof(double));
        CHECK(refused(&d, row[i].inf ? CLOTH_ERR_NONFINITE : CLOTH_ERR_ARGUMENT, row[i].name,
                      row[i].text));
    }
    {
        cloth_desc d = good();
        d.material.membrane = 1e308;
        d.material.poisson = 0.45;
        d.material.plane = CLOTH_PLANE_STRAIN_3D;
        CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "membrane = 1e308", "beyond any double"));
    }
}

static void bad_ladder(void) {
    cloth_desc d = good();
    d.membrane = (cloth_membrane)7;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.membrane", "7"));
    d = good();
    d.bend = CLOTH_BEND_SHELL;
    CHECK(refused(&d, CLOTH_ERR_UNSUPPORTED, "desc.bend", "CLOTH_BEND_SHELL"));
    d.bend = (cloth_bend_model)0;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.bend", "0"));
    d = good();
    d.integrator = (cloth_integrator)4;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.integrator", "4"));
    d = good();
    d.contact = (cloth_contact_rung)4;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.contact", "4"));
    d = good();
    d.rest_angle = (cloth_rest_angle)3;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.rest_angle", "3"));
    d = good();
    d.linear = (cloth_linear)9;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.linear", "9"));
}

/* A rung that is not built is not passed over: the step says so and changes nothing. */
static void contact_without_contact(void) {
    cloth_desc   d = good();
    cloth_sim   *s = NULL;
    cloth_report r;
    uint64_t     hash;
    d.contact = CLOTH_CONTACT_SELF;
    CHECK(cloth_model_create(&d, &sheet.model) == CLOTH_OK);
    CHECK(cloth_sim_create(sheet.model, &s) == CLOTH_OK);
    hash = cloth_sim_hash(s);
    CHECK(cloth_step(s, 0.01, &r) == CLOTH_ERR_UNSUPPORTED && r.outcome == CLOTH_STEP_NONE);
    CHECK(strstr(told.text, "CLOTH_CONTACT_SELF") && hash == cloth_sim_hash(s));
    cloth_sim_destroy(s);
}

static void bad_numbers(void) {
    static const struct { const char *name; size_t at; double value; const char *text; int inf; }
    row[] = {
        {"gravity", offsetof(cloth_desc, gravity) + 8, NAN, "NaN", 1},
        {"wind", offsetof(cloth_desc, wind) + 16, -INFINITY, "-inf", 1},
        {"air_density", offsetof(cloth_desc, air_density), -1, "-1", 0},
        {"air_density", offsetof(cloth_desc, air_density), NAN, "NaN", 1},
        {"drag", offsetof(cloth_desc, drag), -0.25, "-0.25", 0},
        {"lift", offsetof(cloth_desc, lift), -2, "-2", 0},
        {"lift", offsetof(cloth_desc, lift), NAN, "NaN", 1},
        {"desc.tolerance", offsetof(cloth_desc, tolerance), 0, "0", 0},
        {"desc.tolerance", offsetof(cloth_desc, tolerance), NAN, "NaN", 1},
        {"cg_tolerance", offsetof(cloth_desc, cg_tolerance), 0, "0", 0},
        {"cg_tolerance", offsetof(cloth_desc, cg_tolerance), 1, "1", 0}};
    static const struct { const char *name; size_t at; int value; const char *text; } count[] = {
        {"substeps", offsetof(cloth_desc, substeps), -1, "-1"},
        {"substeps", offsetof(cloth_desc, substeps), 1000001, "1000001"},
        {"max_newton", offsetof(cloth_desc, max_newton), -4, "-4"},
        {"max_attachments", offsetof(cloth_desc, max_attachments), -1, "-1"},
        {"max_attachments", offsetof(cloth_desc, max_attachments), 65536, "65536"}};
    size_t i;
    for (i = 0; i < sizeof row / sizeof *row; i++) {
        cloth_desc d = good();
        memcpy((char *)&d + row[i].at, &row[i].value, sizeof(double));
        CHECK(refused(&d, row[i].inf ? CLOTH_ERR_NONFINITE : CLOTH_ERR_ARGUMENT, row[i].name,
                      row[i].text));
    }
    for (i = 0; i < sizeof count / sizeof *count; i++) {
        cloth_desc d = good();
        memcpy((char *)&d + count[i].at, &count[i].value, sizeof(int));
        CHECK(refused(&d, CLOTH_ERR_ARGUMENT, count[i].name, count[i].text));
    }
}

static void bad_pins(void) {
    cloth_desc d = good();
    cloth_pin  pin[2];
    memset(pin, 0, sizeof pin);
    pin[0].axes = pin[1].axes = CLOTH_AXIS_ALL;
    d.npins = 2;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.pins", "NULL"));
    d.pins = pin;
    pin[1].vertex = d.nv;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.pins[1].vertex", "must be 0 to "));
    pin[1].vertex = -1;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.pins[1].vertex", "-1"));
    pin[1].vertex = 1;
    pin[1].axes = 0;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.pins[1].axes", "0"));
    pin[1].axes = 8;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.pins[1].axes", "8"));
    d.npins = -1;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.npins", "-1 must be 0 to "));
}

static void bad_ties(void) {
    cloth_desc d = good();
    cloth_tie  tie[3];
    int        i;
    for (i = 0; i < 3; i++) {
        tie[i].leader = i;
        tie[i].follower = i + 1;
        tie[i].axes = CLOTH_AXIS_Y;
    }
    d.nties = 3;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.ties", "NULL"));
    d.ties = tie;
    tie[1].leader = d.nv;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.ties[1]", "leader"));
    tie[1].leader = 2;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.ties[1].leader = 2", "follower"));
    tie[1].leader = 1;
    tie[2].axes = 9;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.ties[2].axes", "9"));
    tie[2].axes = CLOTH_AXIS_Y;
    tie[2].follower = 0;                    /* 0 leads 1 leads 2 leads 0 */
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.ties", "follows itself"));
    tie[2].leader = 5;
    tie[2].follower = 1;                    /* 1 already follows 0 */
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.ties[2]", "already follows 0"));
    d.nties = -1;
    CHECK(refused(&d, CLOTH_ERR_ARGUMENT, "desc.nties", "-1 must be 0 to "));
    d = good();
    d.nties = 1;
    d.ties = tie;
    d.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    CHECK(refused(&d, CLOTH_ERR_UNSUPPORTED, "desc.nties", "LEAPFROG"));
}

static void quadratic_needs_flat(void) {
    cloth_desc   d = good();
    cloth_model *m = NULL;
    double      *x = (double *)malloc(3 * (size_t)d.nv * sizeof(double));
    memcpy(x, d.x_rest, 3 * (size_t)d.nv * sizeof(double));
    x[3 * 5 + 1] += 0.02;
    d.x_rest = x;
    d.bend = CLOTH_BEND_QUADRATIC;
    CHECK(refused(&d, CLOTH_ERR_UNSUPPORTED, "CLOTH_BEND_QUADRATIC", "hinge"));
    d.rest_angle = CLOTH_REST_ANGLE_FLAT;
    CHECK(cloth_model_create(&d, &m) == CLOTH_OK);
    cloth_model_destroy(m);
    free(x);
    CHECK(told.live == 0);
}

/* n faces around one vertex, the hub first or last in the numbering. */
static void hub(int n, int last) {
    cloth_desc   d = good();
    double      *x = (double *)calloc(3 * (size_t)n + 3, sizeof(double));
    int         *f = (int *)malloc(3 * (size_t)n * sizeof(int)), i, rim = last ? 0 : 1;
    cloth_model *m = NULL;
    clock_t      start = clock();
    double       seconds;
    for (i = 0; i < n; i++) {
        double a = 6.283185307179586 * i / n, *p = x + 3 * (size_t)(i + rim);
        p[0] = (double)n * cos(a);
        p[2] = -(double)n * sin(a);
        f[3 * i] = last ? n : 0;
        f[3 * i + 1] = rim + i;
        f[3 * i + 2] = rim + (i + 1) % n;
    }
    d.nv = n + 1;
    d.nf = n;
    d.x_rest = x;
    d.faces = f;
    CHECK(cloth_model_create(&d, &m) == CLOTH_OK || (m == NULL && told.errors > 0));
    cloth_model_destroy(m);
    seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    if (!(seconds < 1e-5 * n + 1)) printf("  %d faces on one vertex: %g s\n", n, seconds);
    CHECK(seconds < 1e-5 * n + 1);
    CHECK(told.live == 0);
    free(x);
    free(f);
}

static void many_faces_on_one_vertex(void) {
    const int n = test_full() ? 1000000 : 20000;
    hub(n, 0);
    hub(n, 1);
}

/* A chain of ties against the order of the vertices takes no longer than one along it. */
static void chain_of_ties(void) {
    enum { N = 201 };
    static cloth_tie tie[N * N];
    double           seconds[2];
    int              k, i;
    for (k = 0; k < 2; k++) {
        cloth_model *m = NULL;
        clock_t      start;
        scene_close(&sheet);
        scene_desc(&sheet, N, NULL, 0);
        for (i = 0; i + 1 < N * N; i++) {
            tie[i].leader = i + k;
            tie[i].follower = i + 1 - k;
            tie[i].axes = CLOTH_AXIS_ALL;
        }
        sheet.desc.nties = N * N - 1, sheet.desc.ties = tie;
        start = clock();
        CHECK(cloth_model_create(&sheet.desc, &m) == CLOTH_OK);
        seconds[k] = (double)(clock() - start) / CLOCKS_PER_SEC;
        cloth_model_destroy(m);
    }
    if (!CHECK(seconds[1] < 3 * seconds[0] + 0.5))
        printf("  a chain along the vertices %g s, against them %g s\n", seconds[0], seconds[1]);
}

/* --- files of others --- */

/* v and f lines of OBJ text, n-gons as fans; what cannot be read as an index becomes 0. */
static int read_obj(const char *path, double **x, int *nv, int **faces, int *nf) {
    FILE *in = fopen(path, "r");
    static char line[1 << 16];
    int   cv = 0, cf = 0;
    *x = NULL;
    *faces = NULL;
    *nv = *nf = 0;
    if (!in) return 0;
    while (fgets(line, (int)sizeof line, in)) {
        double p[3] = {0, 0, 0};
        char  *at;
        int    corner[3], n = 0;
        if (line[0] == 'v' && line[1] == ' ') {
            (void)sscanf(line + 2, "%lf %lf %lf", p, p + 1, p + 2);
            if (*nv == cv)
                *x = (double *)realloc(*x, 3 * (size_t)(cv = 2 * cv + 64) * sizeof(double));
            memcpy(*x + 3 * (size_t)(*nv)++, p, sizeof p);
        }
        if (line[0] != 'f' || line[1] != ' ') continue;
        for (at = strtok(line + 2, " \r\n\t"); at; at = strtok(NULL, " \r\n\t")) {
            int i = atoi(at);
            i = i < 0 ? *nv + i : i - 1;
            if (n < 2) corner[n] = i;
            else {
                corner[2] = i;
                if (*nf == cf)
                    *faces = (int *)realloc(*faces, 3 * (size_t)(cf = 2 * cf + 64) * sizeof(int));
                memcpy(*faces + 3 * (size_t)(*nf)++, corner, sizeof corner);
                corner[1] = i;
            }
            n++;
        }
    }
    fclose(in);
    return 1;
}

/* Refused with a sentence, or a model whose sim makes a step: never a crash, never a NaN. */
static void one_file(const char *name, int *works) {
    char         path[200];
    cloth_desc   d = good();
    double      *x;
    int         *f, k;
    cloth_model *m = NULL;
    cloth_sim   *s = NULL;
    snprintf(path, sizeof path, "data/nasty/%s", name);
    if (!read_obj(test_shared(path), &x, &d.nv, &f, &d.nf)) return;
    d.x_rest = x;
    d.faces = f;
    d.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    d.substeps = 1;
    if (cloth_model_create(&d, &m) == CLOTH_OK) {
        cloth_status status;
        (*works)++;
        CHECK(cloth_sim_create(m, &s) == CLOTH_OK);
        status = cloth_step(s, 1e-9, NULL);
        CHECK(status == CLOTH_OK || status == CLOTH_ERR_STEP);
        for (k = 0; k < 3 * d.nv; k++)
            if (!isfinite(cloth_sim_state(s)->x[k])) break;
        CHECK(k == 3 * d.nv);
        cloth_sim_destroy(s);
        cloth_model_destroy(m);
    } else {
        CHECK(!m && told.errors > 0);
    }
    CHECK(told.live == 0);
    free(x);
    free(f);
}

static void nasty_meshes(void) {
    static const char *const name[] = {
        "busted.obj", "fan3.obj", "hourglass_ico.obj", "moebius.obj", "negative_indices.obj",
        "skirt_f_duplicate_faces.obj", "skirt_f_far_from_origin_1e5.obj",
        "skirt_f_flipped_faces.obj", "skirt_f_isolated_vertices.obj",
        "skirt_f_near_coincident.obj", "skirt_f_nonmanifold_fins.obj",
        "skirt_f_repeated_index.obj", "skirt_f_shuffled_soup_holes.obj",
        "skirt_f_tiny_scale_1e-4.obj", "skirt_f_unwelded.obj", "skirt_f_zero_area.obj",
        "soup.obj"};
    size_t i;
    int    works = 0;
    if (!*test_shared("data/nasty/busted.obj")) SKIP("no shared data beside the checkout");
    for (i = 0; i < sizeof name / sizeof *name; i++) one_file(name[i], &works);
    printf("  %d of %d nasty meshes can be simulated\n", works, (int)i);
    CHECK(works >= 4);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(accepted_and_freed);
    RUN(null_and_cookie);
    RUN(bad_hooks);
    RUN(bad_counts);
    RUN(nonfinite_arrays);
    RUN(bad_mass);
    RUN(bad_faces);
    RUN(sizes_beyond_doubles);
    RUN(bad_part_and_region);
    RUN(bad_material);
    RUN(bad_ladder);
    RUN(contact_without_contact);
    RUN(bad_numbers);
    RUN(bad_pins);
    RUN(bad_ties);
    RUN(quadratic_needs_flat);
    RUN(many_faces_on_one_vertex);
    RUN(chain_of_ties);
    RUN(nasty_meshes);
    scene_close(&sheet);
    return TEST_END();
}
