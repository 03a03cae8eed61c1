/* test_pools.c - the two pools of examples/: no worker beyond the hook's max_workers, whatever
 * OpenMP is told later; loops of several threads at once, as sims of one model run them.
 * tier: default, as OpenMP keeps memory to the end, which memcheck takes for a leak.
 *   cc -std=c99 -O2 -ffp-contract=off -fopenmp -pthread -DCLOTHSIM_IMPLEMENTATION -I.. \
 *      -I../examples test_pools.c -o test_pools -lm && ./test_pools */
#include "clothsim.h"
#include "test.h"
#include "../examples/parallel_openmp.h"
#include "../examples/parallel_pthreads.h"

enum { COUNT = 300, CALLERS = 3, LOOPS = 20000, WORKERS = 2 };

typedef struct loop_ {
    int begun[COUNT], workers, beyond;      /* how often an item was begun                      */
} loop_;

/* Each item belongs to one range: only `beyond` is written by several threads, with one value. */
static void item(int begin, int end, int worker, void *ctx) {
    loop_ *l = (loop_ *)ctx;
    if (worker < 0 || worker >= l->workers) __atomic_store_n(&l->beyond, 1, __ATOMIC_RELAXED);
    for (int i = begin; i < end; i++) l->begun[i]++;
}

/* How many items were not begun once, or 1 for a worker that is none. */
static int run(const cloth_parallel *hook) {
    loop_ l = {{0}, 0, 0};
    int   bad = 0;
    l.workers = hook->max_workers;
    hook->run(hook->user, COUNT, 7, item, &l);
    for (int i = 0; i < COUNT; i++) bad += l.begun[i] != 1;
    return bad + l.beyond;
}

/* gcc's OpenMP is not built for the thread sanitizer, which sees none of its barriers and takes
 * every end of a loop for a race. */
static void openmp_keeps_to_its_hook(void) {
#if defined _OPENMP && !defined __SANITIZE_THREAD__
    cloth_parallel hook;
    omp_set_num_threads(2);
    hook = parallel_openmp();
    CHECK(hook.max_workers == 2);
    omp_set_num_threads(8);
    for (int k = 0; k < 100; k++) CHECK(run(&hook) == 0);
#else
    SKIP("no OpenMP, or the thread sanitizer");
#endif
}

static void *calls(void *user) {
    const cloth_parallel *hook = (const cloth_parallel *)user;
    for (int k = 0; k < LOOPS; k++)
        if (run(hook)) return user;
    return NULL;
}

static void pool_serves_several_callers(void) {
    parallel_pool *pool = parallel_pool_create(WORKERS);
    cloth_parallel hook = parallel_pool_hook(pool);
    pthread_t      thread[CALLERS];
    void          *bad = NULL;
    int            made = 0;
    if (pool == NULL) SKIP("no threads");
    while (made < CALLERS && pthread_create(&thread[made], NULL, calls, &hook) == 0) made++;
    CHECK(made == CALLERS);
    for (int i = 0; i < made; i++) CHECK(pthread_join(thread[i], &bad) == 0 && bad == NULL);
    parallel_pool_destroy(pool);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(openmp_keeps_to_its_hook);
    RUN(pool_serves_several_callers);
    return TEST_END();
}
