/* parallel_openmp.h - cloth_parallel on OpenMP. Compile with -fopenmp; without, it runs serially.
 * SPDX-License-Identifier: MIT
 *
 *     desc.hooks.parallel = parallel_openmp();            all processors
 * The hook keeps the number of threads that OpenMP has when it is made: loops never have more,
 * whoever runs them and whatever is set later. Include after clothsim.h. OpenMP's threads may spin
 * between loops: OMP_WAIT_POLICY=passive. */
#ifndef CLOTHSIM_EXAMPLE_PARALLEL_OPENMP_H
#define CLOTHSIM_EXAMPLE_PARALLEL_OPENMP_H

#ifdef _OPENMP
#include <omp.h>
#endif

static void parallel_openmp_run(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    (void)user;
    if (grain < 1) grain = 1;
#ifdef _OPENMP
    #pragma omp parallel for schedule(dynamic) num_threads((int)(intptr_t)user)
    for (int c = 0; c < (count - 1) / grain + 1; c++)
        fn(c * grain, count - c * grain > grain ? (c + 1) * grain : count, omp_get_thread_num(),
           ctx);
#else
    fn(0, count, 0, ctx);
#endif
}

static inline cloth_parallel parallel_openmp(void) {
    cloth_parallel p = {parallel_openmp_run, NULL, 1};
#ifdef _OPENMP
    p.max_workers = omp_get_max_threads();
    p.user = (void *)(intptr_t)p.max_workers;
#endif
    return p;
}

#endif
