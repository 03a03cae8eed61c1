/* threads.h - a parallel hook of real threads.
 *   int many = 3;  hooks.parallel.run = threads_run;  hooks.parallel.user = &many;
 *   hooks.parallel.max_workers = many;
 * Threads are made and joined for every loop, ranges are dealt in turn; what does not start is done
 * by the caller. Needs -pthread. Include after clothsim.h, in one .c file per program. */
#ifndef CLOTH_TEST_THREADS_H
#define CLOTH_TEST_THREADS_H

#include <pthread.h>

#define THREADS_MOST 16

typedef struct threads_lot {
    int             worker, workers, count, grain;
    cloth_range_fn *fn;
    void           *ctx;
} threads_lot;

static void *threads_main(void *arg) {
    const threads_lot *l = (const threads_lot *)arg;
    int                b;
    for (b = l->worker * l->grain; b < l->count; b += l->workers * l->grain)
        l->fn(b, l->count - b < l->grain ? l->count : b + l->grain, l->worker, l->ctx);
    return NULL;
}

/* user: int, workers, at most THREADS_MOST. */
static void threads_run(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    const int   workers = *(const int *)user;
    pthread_t   thread[THREADS_MOST];
    threads_lot l[THREADS_MOST];
    int         i, made[THREADS_MOST];
    for (i = 0; i < workers; i++) {
        l[i].worker = i, l[i].workers = workers;
        l[i].count = count, l[i].grain = grain;
        l[i].fn = fn, l[i].ctx = ctx;
        made[i] = i > 0 && pthread_create(&thread[i], NULL, threads_main, &l[i]) == 0;
    }
    for (i = 0; i < workers; i++)
        if (!made[i]) (void)threads_main(&l[i]);
    for (i = 0; i < workers; i++)
        if (made[i]) (void)pthread_join(thread[i], NULL);
}

#endif
