/* pool.h - a second thread that spins, for the parallel hook of the bench programs. Needs the
 * __sync builtins of gcc and clang and -pthread. */
#ifndef CLOTH_BENCH_POOL_H
#define CLOTH_BENCH_POOL_H

#include "../../clothsim.h"

#include <pthread.h>
#include <sched.h>

/* A loop is open while the low half of the ticket, the items left, is not 0; the high half counts
 * the loops. A range is claimed by taking items off the ticket in one exchange: when that
 * succeeds the loop is still open, so what stands beside the ticket belongs to it. Nobody waits
 * for a helper that claimed nothing. */
typedef struct bench_pool {
    volatile unsigned long long ticket;
    volatile int    stop;
    volatile long   finished;               /* items                                           */
    int             grain;
    cloth_range_fn *fn;
    void           *ctx;
    pthread_t       thread;
} bench_pool;

static inline int bench_pool_work(bench_pool *p, int worker) {
    int any = 0;
    for (;;) {
        const unsigned long long t = p->ticket;
        const int left = (int)(t & 0xffffffffu), grain = p->grain;
        const int take = left < grain ? left : grain;
        if (left == 0) return any;
        if (!__sync_bool_compare_and_swap(&p->ticket, t, t - (unsigned long long)take)) continue;
        p->fn(left - take, left, worker, p->ctx);
        __sync_fetch_and_add(&p->finished, take);
        any = 1;
    }
}

static inline void *bench_pool_main(void *user) {
    bench_pool *p = (bench_pool *)user;
    int         idle = 0;
    while (!p->stop) {
        if (bench_pool_work(p, 1)) idle = 0;
        else if (++idle > 100000) {
            sched_yield();
            idle = 0;
        }
    }
    return NULL;
}

static inline void bench_pool_run(void *user, int count, int grain, cloth_range_fn *fn,
                                  void *ctx) {
    bench_pool *p = (bench_pool *)user;
    if (count <= grain) {
        if (count > 0) fn(0, count, 0, ctx);
        return;
    }
    p->fn = fn;
    p->ctx = ctx;
    p->grain = grain;
    p->finished = 0;
    __sync_synchronize();
    p->ticket = ((p->ticket >> 32) + 1) << 32 | (unsigned long long)count;
    bench_pool_work(p, 0);
    while (p->finished != count) __sync_synchronize();
}

/* 0 when the thread cannot be made. */
static inline int bench_pool_start(bench_pool *p, cloth_parallel *hook) {
    p->ticket = 0;
    p->stop = 0;
    if (pthread_create(&p->thread, NULL, bench_pool_main, p)) return 0;
    hook->run = bench_pool_run;
    hook->user = p;
    hook->max_workers = 2;
    return 1;
}

static inline void bench_pool_stop(bench_pool *p) {
    p->stop = 1;
    pthread_join(p->thread, NULL);
}

#endif
