/* bench.h - what the bench programs share: clocks, statistics, child processes, CSV files, the
 * line about the machine, the hanging sheet. POSIX: a program defines _XOPEN_SOURCE 600 first.
 * Programs run from tests/, as 'make -C tests bench' does; CSV rows go to out/bench/NAME.csv. */
#ifndef CLOTH_BENCH_H
#define CLOTH_BENCH_H

#include "../../clothsim.h"
#include "../test.h"

#include <errno.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

/* ---- clocks and statistics */

static inline double bench_clock(clockid_t id) {
    struct timespec t;
    clock_gettime(id, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static inline double bench_wall(void) { return bench_clock(CLOCK_MONOTONIC); }
static inline double bench_cpu(void) { return bench_clock(CLOCK_PROCESS_CPUTIME_ID); }

/* For the clock hook: stages in CPU time, which others on the machine hardly disturb. */
static inline double bench_stage(void *user) {
    (void)user;
    return bench_cpu();
}

static inline int bench_ascending(const void *a, const void *b) {
    const double p = *(const double *)a, q = *(const double *)b;
    return (p > q) - (p < q);
}

/* Sorts t in place. */
static inline double bench_median(double *t, int n) {
    qsort(t, (size_t)n, sizeof *t, bench_ascending);
    return n % 2 ? t[n / 2] : 0.5 * (t[n / 2 - 1] + t[n / 2]);
}

/* Slope of the least squares line through (log x, log y). */
static inline double bench_exponent(const double *x, const double *y, int n) {
    double sx = 0, sy = 0, sxx = 0, sxy = 0;
    int    i;
    for (i = 0; i < n; i++) {
        const double p = log(x[i]), q = log(y[i]);
        sx += p, sy += q, sxx += p * p, sxy += p * q;
    }
    return n > 1 ? (n * sxy - sx * sy) / (n * sxx - sx * sx) : 0;
}

/* Largest and root mean square distance of n points. */
static inline double bench_distance(const double *a, const double *b, int n, double *rms) {
    double big = 0, sum = 0;
    int    i, k;
    for (i = 0; i < n; i++) {
        double d = 0;
        for (k = 0; k < 3; k++) d += (a[3 * i + k] - b[3 * i + k]) * (a[3 * i + k] - b[3 * i + k]);
        sum += d;
        if (d > big) big = d;
    }
    if (rms) *rms = sqrt(sum / n);
    return sqrt(big);
}

static inline void *bench_get(size_t count, size_t size) {
    void *p = calloc(count, size);
    if (!p) {
        printf("out of memory\n");
        exit(1);
    }
    return p;
}

/* ---- text: the machine, the flags, CSV */

/* First line of a file that starts with key (NULL: any), without the end of line. */
static inline int bench_line(const char *path, const char *key, char *line, int size) {
    FILE *f = fopen(path, "r");
    int   found = 0;
    if (!f) return 0;
    while (!found && fgets(line, size, f)) found = !key || !strncmp(line, key, strlen(key));
    fclose(f);
    line[strcspn(line, "\n")] = 0;
    return found;
}

/* The flags that a program was built with: what the Makefile noted beside it, without the
 * warnings and what follows them. */
static inline void bench_flags(const char *program, char *text, int size) {
    char  path[1024], *cut;
    const char *slash = strrchr(program, '/');
    snprintf(path, sizeof path, "%.*s/../flags", slash ? (int)(slash - program) : 1,
             slash ? program : ".");
    if (!bench_line(path, NULL, text, size)) snprintf(text, (size_t)size, "flags not known");
    cut = strstr(text, " -W");
    if (cut) *cut = 0;
}

static inline void bench_machine(const char *program) {
    char model[256] = "", load[128] = "", flags[512];
    const char *colon;
    bench_line("/proc/cpuinfo", "model name", model, sizeof model);
    bench_line("/proc/loadavg", NULL, load, sizeof load);
    bench_flags(program, flags, sizeof flags);
    colon = strchr(model, ':');
    load[strcspn(load, " ")] = 0;
    printf("machine: %s, %ld cores, load %s before\n", colon ? colon + 2 : "unknown",
           sysconf(_SC_NPROCESSORS_ONLN), load);
#ifdef __VERSION__
    printf("compiler: " __VERSION__ "\n");
#endif
    printf("flags: %s\n", flags);
}

/* The same program built with other flags by 'make bench', "" when it is not there. */
static inline const char *bench_twin(const char *flavour, const char *name) {
    static char path[256];
    snprintf(path, sizeof path, "out/%s/bench/%s", flavour, name);
    return access(path, X_OK) ? "" : path;
}

static inline FILE *bench_csv(const char *name, const char *header) {
    char  path[256];
    FILE *f;
    mkdir("out", 0777);
    mkdir("out/bench", 0777);
    snprintf(path, sizeof path, "out/bench/%s.csv", name);
    f = fopen(path, "w");
    if (!f) {
        printf("cannot write %s: is this tests/?\n", path);
        exit(1);
    }
    fprintf(f, "%s\n", header);
    return f;
}

/* ---- child processes */

/* Runs argv (NULL at its end), keeps the first size - 1 bytes of its output; returns its CPU
 * seconds, user and system, or -1 when it failed. */
static inline double bench_spawn(const char *const *argv, char *out, size_t size) {
    struct rusage a, b;
    size_t  have = 0;
    ssize_t got;
    int     fd[2], status = -1;
    pid_t   child;
    char    rest[256];
    fflush(stdout);
    getrusage(RUSAGE_CHILDREN, &a);
    if (pipe(fd)) return -1;
    child = fork();
    if (child == 0) {
        dup2(fd[1], 1);
        close(fd[0]);
        close(fd[1]);
        execv(argv[0], (char *const *)(size_t)argv);
        _exit(127);
    }
    close(fd[1]);
    do {
        const size_t room = have + 1 < size ? size - 1 - have : 0;
        got = read(fd[0], room ? out + have : rest, room ? room : sizeof rest);
        if (got > 0 && room) have += (size_t)got;
    } while (got > 0 || (got < 0 && errno == EINTR));
    out[have] = 0;
    close(fd[0]);
    if (child < 0 || waitpid(child, &status, 0) != child || status) return -1;
    getrusage(RUSAGE_CHILDREN, &b);
    return (double)(b.ru_utime.tv_sec + b.ru_stime.tv_sec - a.ru_utime.tv_sec -
                    a.ru_stime.tv_sec) +
           1e-6 * (double)(b.ru_utime.tv_usec + b.ru_stime.tv_usec - a.ru_utime.tv_usec -
                           a.ru_stime.tv_usec);
}

/* The yardstick, split at blanks: 'yardstick 64 1 1e4 ...'. -1 when it is not there or failed. */
static inline double bench_yardstick(const char *args, char *out, size_t size) {
    char        text[512], *word;
    const char *argv[32] = {"out/bench/yardstick"};
    int         n = 1;
    if (access(argv[0], X_OK)) return -1;
    snprintf(text, sizeof text, "%s", args);
    for (word = strtok(text, " "); word && n < 31; word = strtok(NULL, " ")) argv[n++] = word;
    argv[n] = NULL;
    return bench_spawn(argv, out, size);
}

/* ---- the hanging sheet: 1 m, n x n vertices, horizontal, held at two corners */

static inline cloth_desc bench_desc(double stiffness, double rigidity, double tolerance) {
    cloth_desc d = cloth_desc_default();
    d.material.density = 0.2;
    d.material.membrane = stiffness;
    d.material.poisson = 0.3;
    d.material.bending = rigidity;
    d.material.damping = 0;
    d.tolerance = tolerance;
    return d;
}

static inline cloth_status bench_sheet(cloth_desc *d, int n, cloth_model **model,
                                       cloth_sim **sim) {
    cloth_mesh  *mesh = NULL;
    cloth_pin    pins[2];
    cloth_status status;
    *model = NULL;
    *sim = NULL;
    pins[0].vertex = (n - 1) * n;
    pins[1].vertex = n * n - 1;
    pins[0].axes = pins[1].axes = CLOTH_AXIS_ALL;
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, 1.0, 1.0, &mesh);
    if (status) return status;
    d->nv = mesh->nv, d->x_rest = mesh->x;
    d->nf = mesh->nf, d->faces = mesh->faces;
    d->npins = 2, d->pins = pins;
    status = cloth_model_create(d, model);
    if (!status) status = cloth_sim_create(*model, sim);
    cloth_mesh_destroy(NULL, mesh);
    return status;
}

static inline void bench_free(cloth_model **model, cloth_sim **sim) {
    cloth_sim_destroy(*sim);
    cloth_model_destroy(*model);
    *sim = NULL;
    *model = NULL;
}

/* Writes positions and velocities into a sim; the history goes. */
static inline void bench_put(cloth_sim *sim, int nv, const double *x, const double *v) {
    cloth_state *s = cloth_sim_state(sim);
    memcpy(s->x, x, 3 * (size_t)nv * sizeof *x);
    memcpy(s->v, v, 3 * (size_t)nv * sizeof *v);
    cloth_sim_state_changed(sim);
}

#endif
