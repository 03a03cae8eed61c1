/* bench_drape.c - a sheet falls on a sphere, here and in Bullet: cost against accuracy, in one run.
 *   cc -std=c99 -O3 -march=native -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION \
 *      bench/bench_drape.c -lm && ./a.out
 * A sheet of 1 m and 0.2 kg, N x N vertices (64; DRAPE_N says otherwise), 0.1 m above a sphere of
 * 0.3 m, friction 0.3, contact at 2 mm, no damping; 2 s. One table and three charts
 * (out/bench/drape_*.svg); rows also in out/bench/drape.csv:
 *   ms       CPU time for 1/60 s of motion, mean of all (both on one core, by turns)
 *   cloth    pairs of faces that intersect, at the end and at most (exact.h, every fourth frame)
 *   sphere   faces that reach into the sphere, at the end and at most
 *   stretch  of the longest edge, at the end and at most
 *   rms      distance of the vertices from our own drape at h/8 and a tolerance of 1e-6 m, after
 *            0.2 s (before the folds), 1 s and 2 s; folds are chaotic, so the same drape from a
 *            start that is off by 1e-7 m stands beside it: what is nearer than that is not nearer
 *   low      how far the mean height at 2 s is from that of the drape at h/8
 * Bullet's soft body (bullet_drape.cc, the distribution's package) has links of given lengths: what
 * stretches is what its passes leave over, whatever the cloth; shear and bending are links too. So
 * stiffness in N/m, Poisson's ratio and a plate's rigidity have no counterpart there, nor has an
 * error bound. Its newer world has springs in N/m: 375 of them are Y = 500 N/m with Poisson's ratio
 * of 1/3 on this mesh. Skipped with a printed line where the package is not there. */
#define _XOPEN_SOURCE 600
#include "../../clothsim_collide.h"
#include "../../examples/plot.h"
#include "../../examples/shapes.h"
#include "bench.h"
#include "../exact.h"

enum { FRAMES = 120, EARLY = 12, SECOND = 60, EVERY = 4 };

#define MESH "out/bench/drape_mesh.bin"
#define PATH "out/bench/drape_bullet.bin"

static const double center[3] = {0.5, -0.4, 0.5};
static const double radius = 0.3;

typedef struct ours {
    const char        *name, *label;
    int                substeps, skip;      /* steps a frame; frames a step                    */
    double             tolerance, cg;       /* m; of a linear solve, relative                  */
    cloth_contact_rung contact;
    cloth_integrator   integrator;
    int                series, newton;      /* most iterations a step, 0: no limit             */
} ours;

typedef struct drape {
    double  ms, newton;                     /* a frame                                         */
    int     cloth, cloth_most, sphere, sphere_most, failed;
    double  stretch, stretch_most, early, second, end, low;
    double *x;                              /* [FRAMES x nv x 3]                               */
} drape;

typedef struct stand {                      /* what all runs share                             */
    cloth_mesh *mesh;
    drape       reference;
    FILE       *csv;
    plot       *error, *stretch, *pairs;
    int         n;
} stand;

/* --- one run of ours --- */

static void run_ours(const stand *s, const ours *o, double shift, drape *out) {
    cloth_desc          d = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *c = NULL;
    const int           nv = s->mesh->nv;
    double              total = 0;
    int                 i, k, steps = 0;
    d.nv = nv, d.x_rest = s->mesh->x;
    d.nf = s->mesh->nf, d.faces = s->mesh->faces;
    d.tolerance = o->tolerance, d.cg_tolerance = o->cg;
    d.contact = o->contact, d.max_newton = o->newton;
    d.integrator = o->integrator;
    memset(out, 0, sizeof *out);
    out->x = (double *)bench_get((size_t)FRAMES * 3 * (size_t)nv, sizeof(double));
    CHECK(!cloth_model_create(&d, &model) && !cloth_sim_create(model, &sim));
    CHECK(!cloth_collide_create(sim, NULL, &c));
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = radius;
    CHECK(!cloth_collide_add(c, &ball, &id));
    for (i = 0; shift > 0 && i < 3 * nv; i++)
        cloth_sim_state(sim)->x[i] += shift * cos(12.9898 * i);
    if (shift > 0) cloth_sim_state_changed(sim);
    for (i = 0; i < FRAMES; i++) {
        const double start = bench_cpu();
        for (k = 0; k < o->substeps && i % o->skip == 0; k++, steps++) {
            cloth_report r;
            out->failed += cloth_collide_step(c, o->skip / (60.0 * o->substeps), 4, &r) != CLOTH_OK;
            out->newton += r.newton;
        }
        total += bench_cpu() - start;
        for (k = 0; k < (i + 1 == FRAMES ? 1 : o->skip) && i % o->skip == 0 && i + k < FRAMES; k++)
            memcpy(out->x + (size_t)(i + k) * 3 * (size_t)nv, cloth_sim_state(sim)->x,
                   3 * (size_t)nv * sizeof(double));
    }
    out->ms = 1e3 * total / FRAMES;
    out->newton /= steps;
    cloth_collide_destroy(c);
    bench_free(&model, &sim);
}

/* --- what became of it --- */

static double edge_stretch(const stand *s, const double *x) {
    double most = 0;
    int    i, k;
    for (i = 0; i < s->mesh->nf; i++)
        for (k = 0; k < 3; k++) {
            const int    a = 3 * s->mesh->faces[3 * i + k];
            const int    b = 3 * s->mesh->faces[3 * i + (k + 1) % 3];
            const double now = bench_distance(x + a, x + b, 1, NULL);
            most = fmax(most, now / bench_distance(s->mesh->x + a, s->mesh->x + b, 1, NULL) - 1);
        }
    return most;
}

/* Distance of the sphere's centre from a face, m: of its plane, or of its nearest edge. */
static double face_distance(const double *a, const double *b, const double *c) {
    const double *v[3];
    double        n[3], e[3][3], r[3][3], nn = 0, above = 0, best = HUGE_VAL;
    int           i, k, outside = 0;
    v[0] = a, v[1] = b, v[2] = c;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) {
            e[i][k] = v[(i + 1) % 3][k] - v[i][k];
            r[i][k] = center[k] - v[i][k];
        }
    for (k = 0; k < 3; k++) {
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
        nn += n[k] * n[k];
        above += n[k] * r[0][k];
    }
    for (i = 0; i < 3; i++) {
        double side = 0, t = 0, ee = 0, dd = 0;
        for (k = 0; k < 3; k++) {
            const int p = (k + 1) % 3, q = (k + 2) % 3;
            side += n[k] * (e[i][p] * r[i][q] - e[i][q] * r[i][p]);
            t += e[i][k] * r[i][k];
            ee += e[i][k] * e[i][k];
        }
        if (side < 0) outside = 1;
        t = ee > 0 ? fmin(1, fmax(0, t / ee)) : 0;
        for (k = 0; k < 3; k++) dd += (r[i][k] - t * e[i][k]) * (r[i][k] - t * e[i][k]);
        best = fmin(best, dd);
    }
    return !outside && nn > 0 ? fabs(above) / sqrt(nn) : sqrt(best);
}

static int inside(const stand *s, const double *x) {
    const int *f = s->mesh->faces;
    int        i, count = 0;
    for (i = 0; i < s->mesh->nf; i++, f += 3)
        count += face_distance(x + 3 * f[0], x + 3 * f[1], x + 3 * f[2]) < radius;
    return count;
}

static int finite(const double *x, int n) {
    int i;
    for (i = 0; i < n; i++)
        if (!(fabs(x[i]) < 1e3)) return 0;
    return 1;
}

static double height(const double *x, int nv) {
    double sum = 0;
    int    i;
    for (i = 0; i < nv; i++) sum += x[3 * i + 1];
    return sum / nv;
}

/* 0 when it flew apart. */
static int judge(const stand *s, drape *d) {
    const int    nv = s->mesh->nv;
    const size_t size = 3 * (size_t)nv;
    const double *ref = s->reference.x;
    int          i;
    for (i = EVERY - 1; i < FRAMES; i += EVERY) {
        const double *x = d->x + (size_t)i * size;
        if (!finite(x, 3 * nv)) return 0;
        d->cloth = exact_intersections(nv, x, s->mesh->nf, s->mesh->faces, NULL, 0);
        d->sphere = inside(s, x);
        d->stretch = edge_stretch(s, x);
        d->cloth_most = d->cloth > d->cloth_most ? d->cloth : d->cloth_most;
        d->sphere_most = d->sphere > d->sphere_most ? d->sphere : d->sphere_most;
        d->stretch_most = fmax(d->stretch_most, d->stretch);
    }
    if (!ref) return 1;
    bench_distance(d->x + (EARLY - 1) * size, ref + (EARLY - 1) * size, nv, &d->early);
    bench_distance(d->x + (SECOND - 1) * size, ref + (SECOND - 1) * size, nv, &d->second);
    bench_distance(d->x + (FRAMES - 1) * size, ref + (FRAMES - 1) * size, nv, &d->end);
    d->low = height(d->x + (FRAMES - 1) * size, nv) - height(ref + (FRAMES - 1) * size, nv);
    return 1;
}

static void show(stand *s, const char *name, const char *label, int series, const drape *d,
                 int good) {
    if (!good) {
        printf("  %-50s %7.1f   %s\n", name, d->ms, d->ms > 0 ? "flew apart" : "not done in 100 s");
        fprintf(s->csv, "%s,%d,%g,,,,,,,,,,\n", name, s->n, d->ms);
        if (series >= 0) plot_point(s->error, series, d->ms, HUGE_VAL, label);
        fflush(stdout);
        return;
    }
    printf("  %-50s %7.1f %5d %5d  %5d %5d  %6.1f %6.1f  %6.2f %6.1f %6.1f  %+6.1f\n", name, d->ms,
           d->cloth, d->cloth_most, d->sphere, d->sphere_most, 100 * d->stretch,
           100 * d->stretch_most, 1e3 * d->early, 1e3 * d->second, 1e3 * d->end, 1e3 * d->low);
    fprintf(s->csv, "%s,%d,%g,%d,%d,%d,%d,%g,%g,%g,%g,%g,%g\n", name, s->n, d->ms, d->cloth,
            d->cloth_most, d->sphere, d->sphere_most, d->stretch, d->stretch_most, d->early,
            d->second, d->end, d->low);
    fflush(stdout);
    if (series < 0) return;
    plot_point(s->error, series, d->ms, d->early, label);
    plot_point(s->stretch, series, d->ms, d->stretch_most, label);
    plot_point(s->pairs, series, d->ms, d->cloth_most + d->sphere_most, label);
}

static void title(void) {
    printf("  %-50s %7s %11s  %11s  %13s  %20s  %6s\n", "", "ms for", "pairs cloth", "face-sphere",
           "stretch %", "rms mm at", "low");
    printf("  %-50s %7s %5s %5s  %5s %5s  %6s %6s  %6s %6s %6s  %6s\n", "setting", "1/60 s", "end",
           "most", "end", "most", "end", "most", "0.2 s", "1 s", "2 s", "mm");
}

/* --- ours --- */

#define EULER CLOTH_INTEGRATOR_EULER
#define USUAL CLOTH_DEFAULT_CG_TOLERANCE
#define TENTH 0.05                          /* with contact solves go to twice that, [9.2]     */
#define BDF2  CLOTH_INTEGRATOR_BDF2
#define SELF  CLOTH_CONTACT_SELF
#define ONLY  CLOTH_CONTACT_OBSTACLES

static void all_ours(stand *s) {
    static const ours list[] = {
        {"clothsim h 1/60, tolerance 1e-4 m", "1e-4", 1, 1, 1e-4, USUAL, SELF, EULER, 0, 0},
        {"clothsim h 1/60, 1e-3", "1e-3", 1, 1, 1e-3, USUAL, SELF, EULER, 0, 0},
        {"clothsim h 1/60, 1e-2", "1e-2", 1, 1, 1e-2, USUAL, SELF, EULER, 0, 0},
        {"clothsim h 1/60, 1e-2, CG 0.1", "CG", 1, 1, 1e-2, TENTH, SELF, EULER, 0, 0},
        {"clothsim h 1/60, 1e-4, obstacles only", "1e-4", 1, 1, 1e-4, USUAL, ONLY, EULER, 1, 0},
        {"clothsim h 1/60, 1e-2, obstacles only", "1e-2", 1, 1, 1e-2, USUAL, ONLY, EULER, 1, 0},
        {"clothsim h 1/60, 1e-2, CG 0.1, obstacles", "CG", 1, 1, 1e-2, TENTH, ONLY, EULER, 1, 0},
        {"clothsim h 1/30, 1e-3", "1/30", 1, 2, 1e-3, USUAL, SELF, EULER, 2, 0},
        {"clothsim h 1/120, 1e-3", "1/120", 2, 1, 1e-3, USUAL, SELF, EULER, 2, 0},
        {"clothsim h 1/240, 1e-3", "1/240", 4, 1, 1e-3, USUAL, SELF, EULER, 2, 0},
        {"clothsim BDF2, h 1/60, 1e-3", "1/60", 1, 1, 1e-3, USUAL, SELF, BDF2, 3, 0},
        {"clothsim BDF2, h 1/60, 1e-3, CG 0.1", "CG", 1, 1, 1e-3, TENTH, SELF, BDF2, 3, 0},
        {"clothsim BDF2, h 1/120, 1e-3", "1/120", 2, 1, 1e-3, USUAL, SELF, BDF2, 3, 0},
        {"clothsim BDF2, h 1/60, 1e-3, 3 iterations", "1/60", 1, 1, 1e-3, TENTH, SELF, BDF2, 7, 3},
        {"clothsim BDF2, h 1/30, 1e-2, 4 iterations", "1/30", 1, 2, 1e-2, TENTH, SELF, BDF2, 7, 4},
        {"clothsim BDF2, h 1/60, 3 iterations, obstacles",
         "1/60", 1, 1, 1e-3, TENTH, ONLY, BDF2, 8, 3},
        {"clothsim BDF2, h 1/30, 4 iterations, obstacles",
         "1/30", 1, 2, 1e-2, TENTH, ONLY, BDF2, 8, 4}};
    size_t i;
    for (i = 0; i < sizeof list / sizeof *list; i++) {
        drape d;
        int   good;
        run_ours(s, list + i, 0, &d);
        good = judge(s, &d);
        show(s, list[i].name, list[i].label, list[i].series, &d, good);
        CHECK(good && d.failed == 0 && d.sphere_most == 0);
        if (list[i].contact == SELF) CHECK(d.cloth_most == 0);
        free(d.x);
    }
}

static void references(stand *s) {
    static const ours fine = {"clothsim h 1/480, 1e-6: the reference", "", 8, 1, 1e-6, USUAL, SELF,
                              EULER, -1, 0};
    drape d;
    run_ours(s, &fine, 0, &d);
    s->reference = d;
    CHECK(judge(s, &s->reference) && s->reference.failed == 0);
    show(s, fine.name, "", -1, &s->reference, 1);
    run_ours(s, &fine, 1e-7, &d);
    CHECK(judge(s, &d) && d.failed == 0);
    show(s, "  the same from a start off by 1e-7 m", "", -1, &d, 1);
    plot_hline(s->error, d.early, "another start");
    free(d.x);
}

/* --- Bullet's --- */

typedef struct theirs {
    const char *args, *label;
    int         series;
} theirs;

static int peer_build(void) {
    const char *shell[4] = {"/bin/sh", "-c",
                            "pkg-config --exists bullet && c++ -O3 -march=native "
                            "bench/bullet_drape.cc $(pkg-config --cflags --libs bullet) "
                            "-o out/bench/bullet_drape 2>/dev/null", NULL};
    char        text[256];
    return bench_spawn(shell, text, sizeof text) >= 0;
}

static int run_theirs(const stand *s, const char *args, drape *d) {
    const size_t count = (size_t)FRAMES * 3 * (size_t)s->mesh->nv;
    const char  *argv[32] = {"out/bench/bullet_drape", MESH, PATH};
    char         words[256], number[16], text[256], *word, *end;
    int          n = 4, good;
    FILE        *f;
    memset(d, 0, sizeof *d);
    snprintf(number, sizeof number, "%d", (int)FRAMES);
    snprintf(words, sizeof words, "%s", args);
    argv[3] = number;
    for (word = strtok(words, " "); word && n < 31; word = strtok(NULL, " ")) argv[n++] = word;
    argv[n] = NULL;
    d->x = (double *)bench_get(count, sizeof(double));
    if (bench_spawn(argv, text, sizeof text) < 0) return 0;
    (void)strtod(text, &end);
    d->ms = strtod(end, NULL);
    f = fopen(PATH, "rb");
    good = f && fread(d->x, sizeof(double), count, f) == count;
    if (f) fclose(f);
    return good;
}

static void all_theirs(stand *s) {
    static const theirs list[] = {
        {"iterations=4", "4", 4}, {"iterations=10", "10", 4}, {"iterations=50", "50", 4},
        {"iterations=200", "200", 4}, {"iterations=1000", "1000", 4},
        {"substeps=4 iterations=10", "4 x 10", 5}, {"substeps=16 iterations=1", "16 x 1", 5},
        {"substeps=16 iterations=10", "16 x 10", 5}, {"substeps=16 iterations=50", "16 x 50", 5},
        {"iterations=50 bend=0.1", "", -1}, {"iterations=50 bend=1", "", -1},
        {"iterations=50 voxel=0.25", "", -1}, {"iterations=50 self=flag", "", -1},
        {"iterations=50 self=call", "50", 6}, {"substeps=4 iterations=10 self=call", "4 x 10", 6},
        {"substeps=16 iterations=10 self=call", "16 x 10", 6},
        {"world=implicit stiffness=375 substeps=16", "", -1},
        {"world=explicit stiffness=375 substeps=128 self=flag", "", -1}};
    size_t i;
    if (!peer_build()) {
        printf("  Bullet skipped: no package libbullet-dev, pkg-config or C++ compiler here\n");
        return;
    }
    for (i = 0; i < sizeof list / sizeof *list; i++) {
        char  name[128];
        drape d;
        int   good = run_theirs(s, list[i].args, &d);
        snprintf(name, sizeof name, "Bullet %s", list[i].args);
        show(s, name, list[i].label, list[i].series, &d, good && judge(s, &d));
        free(d.x);
    }
}

static void open_charts(stand *s) {
    static const char *const series[] = {
        "clothsim: tolerance, h = 1/60 s", "clothsim: without self-contact",
        "clothsim: time step, 1e-3 m", "clothsim: BDF2, 1e-3 m", "Bullet: iterations",
        "Bullet: substeps x iterations", "Bullet: clusters against clusters",
        "clothsim: BDF2, 3 or 4 iterations", "the same without self-contact"};
    static const char *const x = "CPU time for 1/60 s of motion (ms)";
    size_t i;
    s->error = plot_open("Sheet on a sphere: error before the folds", x, "rms after 0.2 s (m)");
    s->stretch = plot_open("Sheet on a sphere: largest stretch", x, "of the longest edge");
    s->pairs = plot_open("Sheet on a sphere: intersections", x, "pairs at most");
    plot_axes(s->error, 1, 1);
    plot_axes(s->stretch, 1, 1);
    plot_axes(s->pairs, 1, 0);
    for (i = 0; i < sizeof series / sizeof *series; i++) {
        plot_series(s->error, series[i]);
        plot_series(s->stretch, series[i]);
        plot_series(s->pairs, series[i]);
    }
}

static void drapes(void) {
    const char *n = getenv("DRAPE_N");
    stand       s;
    FILE       *f;
    memset(&s, 0, sizeof s);
    s.n = n ? atoi(n) : 64;
    s.csv = bench_csv("drape", "setting,n,ms,cloth,cloth_most,sphere,sphere_most,stretch,"
                               "stretch_most,rms_early,rms_second,rms_end,low");
    CHECK(!cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, s.n, s.n, 1.0, 1.0, &s.mesh));
    f = fopen(MESH, "wb");
    CHECK(f != NULL);
    if (!f || !s.mesh) return;
    CHECK(fwrite(&s.mesh->nv, sizeof(int), 1, f) == 1);
    CHECK(fwrite(&s.mesh->nf, sizeof(int), 1, f) == 1);
    CHECK(fwrite(s.mesh->x, 3 * sizeof(double), (size_t)s.mesh->nv, f) == (size_t)s.mesh->nv);
    CHECK(fwrite(s.mesh->faces, 3 * sizeof(int), (size_t)s.mesh->nf, f) == (size_t)s.mesh->nf);
    fclose(f);
    open_charts(&s);
    title();
    references(&s);
    all_ours(&s);
    all_theirs(&s);
    CHECK(plot_close(s.error, "out/bench/drape_error.svg") == NULL);
    CHECK(plot_close(s.stretch, "out/bench/drape_stretch.svg") == NULL);
    CHECK(plot_close(s.pairs, "out/bench/drape_pairs.svg") == NULL);
    free(s.reference.x);
    cloth_mesh_destroy(NULL, s.mesh);
    fclose(s.csv);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    bench_machine(argv[0]);
    RUN(drapes);
    return TEST_END();
}
