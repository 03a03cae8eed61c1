/* 11_threads.c - two workers: the same bits as one, in less time.
 *
 * Notice: hooks.parallel is the only thing that changes (parallel_pthreads.h is one such pool,
 * parallel_openmp.h another in a few lines); cloth_sim_hash() covers all that the next step
 * depends on, so equal hashes mean equal states, to the last bit. The kit never starts a thread.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. 11_threads.c -pthread -lm
 *   expected: 1 and 2 workers: same hash
 *
 * Exercises: (1) parallel_pool_create(8): on any machine the hash stays the same;
 * (2) OMP instead: #include "parallel_openmp.h", desc.hooks.parallel = parallel_openmp(), compile
 * with -fopenmp; (3) 60 vertices to 12, pin 11: less gain, a loop costs 1 us. */
#define _POSIX_C_SOURCE 200112L             /* clock_gettime: wall time, not CPU time */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include "parallel_pthreads.h"
#include <stdio.h>
#include <time.h>

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Thirty steps of a sheet that hangs by two corners; its hash and the wall time of the steps. */
static cloth_status run(int workers, uint64_t *hash, double *time) {
    cloth_desc     desc = cloth_desc_default();
    cloth_mesh    *sheet = NULL;
    cloth_model   *model = NULL;
    cloth_sim     *sim = NULL;
    cloth_pin      pins[2] = {{0, CLOTH_AXIS_ALL}, {59, CLOTH_AXIS_ALL}};
    parallel_pool *pool = parallel_pool_create(workers);
    cloth_status   status = CLOTH_ERR_MEMORY;

    desc.hooks.log.fn = cloth_log_stderr;
    if (!pool) goto done;
    desc.hooks.parallel = parallel_pool_hook(pool);         /* the one line that matters */
    status = cloth_mesh_sheet(&desc.hooks, CLOTH_SHEET_ALTERNATING, 60, 60, 1.0, 1.0, &sheet);
    if (status) goto done;
    desc.nv = sheet->nv, desc.x_rest = sheet->x;
    desc.nf = sheet->nf, desc.faces = sheet->faces, desc.X = sheet->X;
    desc.npins = 2, desc.pins = pins;
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto done;
    if ((status = cloth_sim_create(model, &sim)) != CLOTH_OK) goto done;
    *time = -seconds();
    for (int step = 0; step < 30 && !status; step++) status = cloth_step(sim, 1.0 / 60, NULL);
    *time += seconds();
    *hash = cloth_sim_hash(sim);
done:
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(&desc.hooks, sheet);
    parallel_pool_destroy(pool);            /* last: the hook has to outlive the sims */
    return status;
}

int main(void) {
    uint64_t     hash[2] = {0, 0};
    double       time[2] = {0, 0};
    cloth_status status = CLOTH_OK;
    for (int i = 0; i < 2; i++) {
        status = run(i + 1, &hash[i], &time[i]);
        if (status) {
            fprintf(stderr, "%d workers: %s\n", i + 1, cloth_status_text(status));
            return 1;
        }
        printf("%d worker%s: hash %08lx%08lx, %.0f ms a step\n", i + 1, i ? "s" : "",
               (unsigned long)(hash[i] >> 32), (unsigned long)(hash[i] & 0xffffffff),
               1e3 * time[i] / 30);
    }
    printf("speed ratio %.2f\n", time[0] / time[1]);
    printf("1 and 2 workers: %s hash\n", hash[0] == hash[1] ? "same" : "ANOTHER");
    return hash[0] != hash[1];
}
