/* dynamics.h - what the programs that move cloth share: a sheet, its sim, reading a table.
 * Include after clothsim.h and test.h. */
#ifndef CLOTH_DYNAMICS_H
#define CLOTH_DYNAMICS_H

typedef struct dyn {                        /* a mesh, the desc made from it, model and sim    */
    cloth_mesh  *mesh;
    cloth_desc   desc;
    cloth_model *model;
    cloth_sim   *sim;
    cloth_state *state;
    double      *mass;                      /* [nv] kg, the sim's                              */
    int          nv;
} dyn;

/* A sheet from (0, 0, 0) to (width, -height, 0), normals +z, rows from the top. Defaults: no
 * gravity, no bending, membrane 100 N/m, 0.2 kg/m^2, nu = 0.3. Change d->desc, then dyn_start. */
static inline void dyn_sheet(dyn *d, cloth_sheet_pattern pattern, int nx, int ny, double width,
                             double height) {
    int i;
    memset(d, 0, sizeof *d);
    d->desc = cloth_desc_default();
    d->desc.sleep = 0;                      /* every step is solved                            */
    d->desc.gravity[1] = 0;
    d->desc.bend = CLOTH_BEND_NONE;
    d->desc.material.membrane = 100;
    d->desc.material.density = 0.2;
    d->desc.material.poisson = 0.3;
    d->desc.material.bending = 0;
    d->desc.material.damping = 0;
    CHECK(cloth_mesh_sheet(NULL, pattern, nx, ny, width, height, &d->mesh) == CLOTH_OK);
    d->nv = d->mesh->nv;
    for (i = 0; i < d->nv; i++) {
        d->mesh->x[3 * i + 1] = -d->mesh->x[3 * i + 2];
        d->mesh->x[3 * i + 2] = 0;
    }
    d->desc.nv = d->nv;
    d->desc.nf = d->mesh->nf;
    d->desc.x_rest = d->mesh->x;
    d->desc.faces = d->mesh->faces;
}

static inline int dyn_start(dyn *d) {
    cloth_status status = cloth_model_create(&d->desc, &d->model);
    CHECK(status == CLOTH_OK);
    if (!status) status = cloth_sim_create(d->model, &d->sim);
    CHECK(status == CLOTH_OK);
    if (status) return 0;
    d->state = cloth_sim_state(d->sim);
    d->mass = cloth_sim_params(d->sim)->mass;
    return 1;
}

static inline void dyn_end(dyn *d) {
    cloth_sim_destroy(d->sim);
    cloth_model_destroy(d->model);
    cloth_mesh_destroy(NULL, d->mesh);
    memset(d, 0, sizeof *d);
}

/* Another desc over the same mesh: ends model and sim only. */
static inline void dyn_restart(dyn *d) {
    cloth_sim_destroy(d->sim);
    cloth_model_destroy(d->model);
    d->sim = NULL;
    d->model = NULL;
    dyn_start(d);
}

static inline double *dyn_copy(const double *a, size_t n) {
    double *b = (double *)malloc((n ? n : 1) * sizeof *b);
    if (b) memcpy(b, a, n * sizeof *b);
    return b;
}

/* sqrt(sum m |a - b|^2 / sum m), m */
static inline double dyn_distance(const dyn *d, const double *a, const double *b) {
    double sum = 0, mass = 0;
    int    i;
    for (i = 0; i < 3 * d->nv; i++) {
        sum += d->mass[i / 3] * (a[i] - b[i]) * (a[i] - b[i]);
        mass += d->mass[i / 3] / 3;
    }
    return sqrt(sum / mass);
}

/* sum m v, and sum m x cross v about the origin */
static inline void dyn_momentum(const dyn *d, double *linear, double *angular) {
    int i, k;
    for (k = 0; k < 3; k++) linear[k] = angular[k] = 0;
    for (i = 0; i < d->nv; i++) {
        const double *x = d->state->x + 3 * i, *v = d->state->v + 3 * i;
        for (k = 0; k < 3; k++) {
            const int a = (k + 1) % 3, b = (k + 2) % 3;
            linear[k] += d->mass[i] * v[k];
            angular[k] += d->mass[i] * (x[a] * v[b] - x[b] * v[a]);
        }
    }
}

static inline double dyn_kinetic(const dyn *d, const double *v) {
    double sum = 0;
    int    i;
    for (i = 0; i < 3 * d->nv; i++) sum += 0.5 * d->mass[i / 3] * v[i] * v[i];
    return sum;
}

/* Largest |a - b| */
static inline double dyn_worst(const double *a, const double *b, int n) {
    double big = 0;
    int    i;
    for (i = 0; i < n; i++)
        if (!(fabs(a[i] - b[i]) <= big)) big = fabs(a[i] - b[i]);
    return big;
}

/* Solves K u = omega^2 M u for the `modes` lowest: K [n x n] definite (becomes its factor), M [n]
 * diagonal. omega [modes]; u [modes x n] with u'Mu = 1, or NULL. Cholesky, then inverse iteration
 * in the complement of what was found. */
static inline void dyn_factor(double *K, int n) {
    int i, j, k;
    for (j = 0; j < n; j++)
        for (i = j; i < n; i++) {
            double s = K[i * n + j];
            for (k = 0; k < j; k++) s -= K[i * n + k] * K[j * n + k];
            K[i * n + j] = i == j ? sqrt(s) : s / K[j * n + j];
        }
}

static inline void dyn_solve(const double *L, int n, double *b) {
    int i, k;
    for (i = 0; i < n; i++) {
        for (k = 0; k < i; k++) b[i] -= L[i * n + k] * b[k];
        b[i] /= L[i * n + i];
    }
    for (i = n - 1; i >= 0; i--) {
        for (k = i + 1; k < n; k++) b[i] -= L[k * n + i] * b[k];
        b[i] /= L[i * n + i];
    }
}

static inline void dyn_modes(double *K, const double *M, int n, int modes, double *omega,
                             double *out) {
    double *u = (double *)malloc((size_t)(n * (modes + 1)) * sizeof *u), *v = u + n * modes;
    int     m, k, i, it;
    dyn_factor(K, n);
    for (m = 0; m < modes; m++) {
        double *a = u + m * n, lambda = 0;
        for (i = 0; i < n; i++) a[i] = sin(1.0 + 0.7 * i * (m + 1)) + (m == 0);
        for (it = 0; it < 400; it++) {
            double dot, norm = 0;
            for (k = 0; k < m; k++) {
                dot = 0;
                for (i = 0; i < n; i++) dot += u[k * n + i] * M[i] * a[i];
                for (i = 0; i < n; i++) a[i] -= dot * u[k * n + i];
            }
            for (i = 0; i < n; i++) norm += a[i] * M[i] * a[i];
            for (i = 0; i < n; i++) {
                a[i] /= sqrt(norm);
                v[i] = M[i] * a[i];
            }
            if (it > 5 && fabs(1 / sqrt(norm) - lambda) < 1e-13 * lambda) break;
            lambda = 1 / sqrt(norm);
            if (it == 399) break;
            dyn_solve(K, n, v);
            memcpy(a, v, (size_t)n * sizeof *a);
        }
        omega[m] = sqrt(lambda);
    }
    if (out) memcpy(out, u, (size_t)(n * modes) * sizeof *u);
    free(u);
}

/* Next row of numbers of a CSV file, into row [n]; words read as NaN. 0 at the end. The first
 * word of a row, when it is one, goes to word [32], which may be NULL. */
static inline int dyn_csv(FILE *f, double *row, int n, char *word) {
    char line[1024], *at = line;
    int  k;
    if (!fgets(line, sizeof line, f)) return 0;
    for (k = 0; k < n; k++) {
        char *end;
        row[k] = strtod(at, &end);
        if (end == at) row[k] = NAN;
        if (k == 0 && word) {
            size_t len = strcspn(at, ",\r\n");
            if (len > 31) len = 31;
            memcpy(word, at, len);
            word[len] = '\0';
        }
        end = strchr(at, ',');
        at = end ? end + 1 : at + strlen(at);
    }
    return 1;
}

/* A table of refdata, past its header row; NULL when there is none. */
static inline FILE *dyn_table(const char *name) {
    const char *path = test_shared(name);
    char        line[1024];
    FILE       *f = *path ? fopen(path, "r") : NULL;
    if (f && !fgets(line, sizeof line, f)) {
        fclose(f);
        f = NULL;
    }
    return f;
}

#endif
