/* parallel_pthreads.h - cloth_parallel on POSIX threads: a fixed pool that sleeps when idle.
 * SPDX-License-Identifier: MIT
 *
 *     parallel_pool *pool = parallel_pool_create(2);      this thread and one more; NULL: none
 *     desc.hooks.parallel = parallel_pool_hook(pool);
 *     ...                                                 models and sims made from desc
 *     parallel_pool_destroy(pool);                        after them
 *
 * C99 with gcc's or clang's atomics; compile with -pthread; include after clothsim.h.
 *
 * One word, the ticket, holds the number of the loop (32 bits) and which of its ranges nobody has
 * taken yet, [low, high) (16 bits each). A range is taken from either end with one
 * compare-and-swap: it succeeds only while this loop's number and ends stand, so a thread that
 * was late can never take a range of a loop that is over, and the loop's fields cannot change
 * under one that took a range, as run() returns only when all ranges are done.
 *
 * Even workers take from the high end, odd ones from the low end: loop after loop, a thread finds
 * most of its ranges' data in the cache of its processor. (With one common end, two workers got
 * leaf after leaf at random.)
 *
 * A worker without work looks at the ticket PARALLEL_SPIN times (some 50 us: the loops of one
 * step follow each other faster), then PARALLEL_YIELD times more, each time giving its processor
 * away where somebody else wants it, then sleeps on a condition: to be woken takes as long as
 * many a loop. A sleeper is not waited for: the calling thread takes ranges too. It waits only
 * for ranges that others have begun, and gives its processor away (sched_yield) when that takes
 * long, as on a busy machine.
 * The pool serves one loop at a time: where sims of one model step in several threads, a loop that
 * finds it busy runs on its own thread alone.
 */
#ifndef CLOTHSIM_EXAMPLE_PARALLEL_PTHREADS_H
#define CLOTHSIM_EXAMPLE_PARALLEL_PTHREADS_H

#include <pthread.h>
#include <sched.h>
#include <stdint.h>
#include <stdlib.h>

#define PARALLEL_SPIN  2000
#define PARALLEL_YIELD 1000
#define PARALLEL_MAX   64
#define PARALLEL_MASK  0xffffu

typedef struct parallel_pool parallel_pool;

typedef struct parallel_worker {
    parallel_pool *pool;
    pthread_t      thread;
    int            number;          /* 1 ..; the calling thread is worker 0                 */
} parallel_worker;

struct parallel_pool {
    uint64_t        ticket;         /* loop << 32 | high << 16 | low           atomic       */
    int             busy;           /* a thread is in run()                    atomic       */
    int             left;           /* ranges not finished                     atomic       */
    int             sleepers, quit; /*                                         atomic       */
    int             count, grain;   /* the loop                                atomic       */
    cloth_range_fn *fn;
    void           *ctx;
    int             n;              /* workers, the calling thread included                 */
    parallel_worker worker[PARALLEL_MAX];
    pthread_mutex_t mutex;          /* of the condition only                                */
    pthread_cond_t  wake;
};

static inline void parallel_pause(void) {
#if defined(__x86_64__) || defined(__i386__)
    __asm__ __volatile__("pause");
#elif defined(__aarch64__)
    __asm__ __volatile__("yield");
#endif
}

static inline uint32_t parallel_low(uint64_t ticket) { return (uint32_t)(ticket & PARALLEL_MASK); }
static inline uint32_t parallel_high(uint64_t ticket) {
    return (uint32_t)(ticket >> 16 & PARALLEL_MASK);
}

/* Takes and runs ranges until none is left. */
static inline void parallel_work(parallel_pool *p, int worker) {
    uint64_t t = __atomic_load_n(&p->ticket, __ATOMIC_ACQUIRE);
    while (parallel_low(t) < parallel_high(t)) {
        int count = __atomic_load_n(&p->count, __ATOMIC_RELAXED);
        int grain = __atomic_load_n(&p->grain, __ATOMIC_RELAXED), begin;
        cloth_range_fn *fn = __atomic_load_n(&p->fn, __ATOMIC_RELAXED);
        void *ctx = __atomic_load_n(&p->ctx, __ATOMIC_RELAXED);
        const uint64_t less = worker % 2 ? t + 1 : t - ((uint64_t)1 << 16);
        /* on failure t is the present ticket */
        if (!__atomic_compare_exchange_n(&p->ticket, &t, less, 0, __ATOMIC_ACQ_REL,
                                         __ATOMIC_ACQUIRE)) continue;
        begin = (int)(worker % 2 ? parallel_low(t) : parallel_high(t) - 1) * grain;
        fn(begin, count - begin > grain ? begin + grain : count, worker, ctx);
        __atomic_sub_fetch(&p->left, 1, __ATOMIC_RELEASE);
        t = __atomic_load_n(&p->ticket, __ATOMIC_ACQUIRE);
    }
}

static inline int parallel_idle(parallel_pool *p) {
    const uint64_t t = __atomic_load_n(&p->ticket, __ATOMIC_SEQ_CST);
    return parallel_low(t) >= parallel_high(t) && !__atomic_load_n(&p->quit, __ATOMIC_SEQ_CST);
}

static inline void *parallel_main(void *user) {
    parallel_worker *w = (parallel_worker *)user;
    parallel_pool   *p = w->pool;
    while (!__atomic_load_n(&p->quit, __ATOMIC_SEQ_CST)) {
        for (int i = 0; i < PARALLEL_SPIN + PARALLEL_YIELD && parallel_idle(p); i++)
            if (i < PARALLEL_SPIN) parallel_pause();
            else sched_yield();
        if (parallel_idle(p)) {
            /* sleepers rises before the last look, run() looks at it after its ticket: one of
             * the two sees the other */
            pthread_mutex_lock(&p->mutex);
            __atomic_add_fetch(&p->sleepers, 1, __ATOMIC_SEQ_CST);
            while (parallel_idle(p)) pthread_cond_wait(&p->wake, &p->mutex);
            __atomic_sub_fetch(&p->sleepers, 1, __ATOMIC_SEQ_CST);
            pthread_mutex_unlock(&p->mutex);
        }
        parallel_work(p, w->number);
    }
    return NULL;
}

static inline void parallel_wake(parallel_pool *p) {
    if (__atomic_load_n(&p->sleepers, __ATOMIC_SEQ_CST) == 0) return;
    pthread_mutex_lock(&p->mutex);
    pthread_cond_broadcast(&p->wake);
    pthread_mutex_unlock(&p->mutex);
}

static inline void parallel_run(void *user, int count, int grain, cloth_range_fn *fn, void *ctx) {
    parallel_pool *p = (parallel_pool *)user;
    uint64_t loop;
    int ranges, spin = 0;
    if (count < 1) return;
    if (__atomic_exchange_n(&p->busy, 1, __ATOMIC_ACQUIRE)) {
        fn(0, count, 0, ctx);
        return;
    }
    loop = (__atomic_load_n(&p->ticket, __ATOMIC_RELAXED) >> 32) + 1;
    if (grain < 1) grain = 1;
    if ((count - 1) / grain >= (int)PARALLEL_MASK) grain = count / (int)PARALLEL_MASK + 1;
    ranges = (count - 1) / grain + 1;
    __atomic_store_n(&p->count, count, __ATOMIC_RELAXED);
    __atomic_store_n(&p->grain, grain, __ATOMIC_RELAXED);
    __atomic_store_n(&p->fn, fn, __ATOMIC_RELAXED);
    __atomic_store_n(&p->ctx, ctx, __ATOMIC_RELAXED);
    __atomic_store_n(&p->left, ranges, __ATOMIC_RELAXED);
    __atomic_store_n(&p->ticket, loop << 32 | (uint64_t)ranges << 16, __ATOMIC_SEQ_CST);
    if (ranges > 1) parallel_wake(p);
    parallel_work(p, 0);
    while (__atomic_load_n(&p->left, __ATOMIC_ACQUIRE) > 0)
        if (++spin < PARALLEL_SPIN) parallel_pause();
        else sched_yield();
    __atomic_store_n(&p->busy, 0, __ATOMIC_RELEASE);
}

/* Ends and joins the workers. NULL allowed. */
static inline void parallel_pool_destroy(parallel_pool *p) {
    if (p == NULL) return;
    __atomic_store_n(&p->quit, 1, __ATOMIC_SEQ_CST);
    parallel_wake(p);
    for (int i = 1; i < p->n; i++) pthread_join(p->worker[i].thread, NULL);
    pthread_cond_destroy(&p->wake), pthread_mutex_destroy(&p->mutex);
    free(p);
}

/* A pool of `workers` (1 to PARALLEL_MAX), the calling thread included. NULL on failure. */
static inline parallel_pool *parallel_pool_create(int workers) {
    parallel_pool *p = NULL;
    if (workers >= 1 && workers <= PARALLEL_MAX) p = (parallel_pool *)calloc(1, sizeof *p);
    if (p == NULL) return NULL;
    if (pthread_mutex_init(&p->mutex, NULL) != 0) { free(p); return NULL; }
    if (pthread_cond_init(&p->wake, NULL) != 0) {
        pthread_mutex_destroy(&p->mutex), free(p);
        return NULL;
    }
    for (p->n = 1; p->n < workers; p->n++) {
        parallel_worker *w = &p->worker[p->n];
        w->pool = p, w->number = p->n;
        if (pthread_create(&w->thread, NULL, parallel_main, w) != 0) {
            parallel_pool_destroy(p);
            return NULL;
        }
    }
    return p;
}

static inline cloth_parallel parallel_pool_hook(parallel_pool *p) {
    cloth_parallel hook = {NULL, NULL, 0};
    if (p != NULL) hook.run = parallel_run, hook.user = p, hook.max_workers = p->n;
    return hook;
}

#endif
