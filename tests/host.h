/* host.h - a host for tests: an allocator that counts and fails on request, a logger that collects,
 * workers that come last first.
 *   host h;  cloth_hooks hooks = host_hooks(&h);  h.fail_at = 3;
 * Include after clothsim.h, in one .c file per program. */
#ifndef CLOTH_TEST_HOST_H
#define CLOTH_TEST_HOST_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define HOST_NAN      ((double)NAN)         /* the macros of math.h are floats                 */
#define HOST_INFINITY ((double)INFINITY)

typedef struct host {
    int  live;              /* blocks not yet freed                                            */
    size_t bytes;           /* in them                                                         */
    int  calls, fail_at;    /* allocations so far; the one that returns NULL, 0: none          */
    int  lines, errors;     /* sentences logged, and those of level error                      */
    int  n;
    char text[65536];       /* the sentences, a line each                                      */
} host;

static inline void *host_alloc(size_t size, void *user) {
    host *h = (host *)user;
    void *p;
    if (++h->calls == h->fail_at) return NULL;
    p = malloc(size);
    if (p) memset(p, 0xa5, size);           /* what is not set shows */
    h->live += p != NULL;
    h->bytes += p ? size : 0;
    return p;
}

static inline void host_free(void *p, size_t size, void *user) {
    ((host *)user)->live -= p != NULL;
    ((host *)user)->bytes -= p ? size : 0;
    free(p);
}

static inline void host_log(cloth_log_level level, cloth_status status, const char *text,
                            void *user) {
    host *h = (host *)user;
    int   n = (int)strlen(text);
    (void)status;
    h->lines++;
    h->errors += level == CLOTH_LOG_ERROR;
    if (h->n + n + 2 > (int)sizeof h->text) return;
    memcpy(h->text + h->n, text, (size_t)n);
    h->n += n;
    h->text[h->n++] = '\n';
    h->text[h->n] = '\0';
}

static inline cloth_hooks host_hooks(host *h) {
    cloth_hooks hooks;
    memset(h, 0, sizeof *h);
    memset(&hooks, 0, sizeof hooks);
    hooks.allocator.alloc = host_alloc;
    hooks.allocator.free = host_free;
    hooks.allocator.user = h;
    hooks.log.fn = host_log;
    hooks.log.user = h;
    return hooks;
}

/* One thread that plays all workers and takes the ranges from the last one on. */
typedef struct host_reverse {
    int workers, ranges;                    /* ranges: taken so far                            */
} host_reverse;

static inline void host_backwards(void *user, int count, int grain, cloth_range_fn *fn,
                                  void *ctx) {
    host_reverse *r = (host_reverse *)user;
    int           b;
    for (b = count > 0 ? (count - 1) / grain * grain : -1; b >= 0; b -= grain, r->ranges++)
        fn(b, count - b < grain ? count : b + grain, b / grain % r->workers, ctx);
}

static inline void host_turn_round(cloth_hooks *hooks, host_reverse *r, int workers) {
    r->workers = workers, r->ranges = 0;
    hooks->parallel.run = host_backwards;
    hooks->parallel.user = r;
    hooks->parallel.max_workers = workers;
}

static inline void host_forget(host *h) {
    h->text[0] = '\0';
    h->lines = h->errors = h->n = 0;
}

#endif
