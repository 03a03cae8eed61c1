/* fuzz.h - what the fuzz_*.c share: promises, a strict host, bytes to draw from, a main without
 * libFuzzer. Include after clothsim.h or clothsim_collide.h, in one .c file per program. */
#ifndef CLOTH_TEST_FUZZ_H
#define CLOTH_TEST_FUZZ_H

#include <stdio.h>
#include "host.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define require(ok) ((ok) ? (void)0 : fuzz_broken(__FILE__, __LINE__, #ok))

static inline void fuzz_broken(const char *file, int line, const char *what) {
    fprintf(stderr, "%s:%d: broken: %s\n", file, line, what);
    abort();
}

/* An error names its status, a sentence is not empty and of printable ASCII. */
static inline void fuzz_log(cloth_log_level level, cloth_status status, const char *text,
                            void *user) {
    size_t i;
    for (i = 0; text[i]; i++) require(text[i] >= ' ' && text[i] <= '~');
    require(i > 0 && (level != CLOTH_LOG_ERROR || status != CLOTH_OK));
    host_log(level, status, text, user);
}

static inline cloth_hooks fuzz_hooks(host *h) {
    cloth_hooks hooks = host_hooks(h);
    hooks.log.fn = fuzz_log;
    return hooks;
}

typedef struct bytes {                      /* those not used yet, then zeros                  */
    const uint8_t *p, *end;
} bytes;

static inline bytes fuzz_bytes(const uint8_t *data, size_t size) {
    bytes b;
    b.p = data;
    b.end = size > 0 ? data + size : data;
    return b;
}

static inline unsigned next(bytes *b) { return b->p < b->end ? *b->p++ : 0; }

#ifdef FUZZ_MAIN

#include <time.h>

static uint64_t fuzz_seed = 1;

static inline size_t fuzz_below(size_t n) {
    fuzz_seed = fuzz_seed * 6364136223846793005u + 1442695040888963407u;
    return n ? (size_t)(fuzz_seed >> 33) % n : 0;
}

static inline double fuzz_clock(void) { return (double)clock() / CLOCKS_PER_SEC; }

static inline size_t fuzz_read(const char *path, uint8_t *b, size_t capacity) {
    FILE  *f = fopen(path, "rb");
    size_t n = f ? fread(b, 1, capacity, f) : 0;
    if (f) fclose(f);
    return n;
}

/* Random bytes for that many seconds; three of four runs keep below `plain`, beyond which bytes
 * stand for the absurd. FUZZ_KEEP in the environment names a file for the bytes under way. */
static inline void fuzz_random(double seconds, unsigned plain, const char *name) {
    const double begin = fuzz_clock();
    const char  *keep = getenv("FUZZ_KEEP");
    long         runs;
    for (runs = 0; fuzz_clock() - begin < seconds; runs++) {
        uint8_t b[1024];
        size_t  i;
        for (i = 0; i < sizeof b; i++) b[i] = (uint8_t)fuzz_below(runs % 4 ? plain : 256);
        if (keep) {
            FILE *f = fopen(keep, "wb");
            if (f) fwrite(b, 1, sizeof b, f), fclose(f);
        }
        LLVMFuzzerTestOneInput(b, sizeof b);
    }
    printf("%s: %ld runs, no finding\n", name, runs);
}

static inline int fuzz_replay(int n, char **files, const char *name) {
    const size_t capacity = (size_t)1 << 26;
    uint8_t     *b = (uint8_t *)malloc(capacity);
    int          i;
    require(b != NULL);
    memset(b, 0, 1);
    LLVMFuzzerTestOneInput(b, 0);
    for (i = 0; i < n; i++) {
        const size_t size = fuzz_read(files[i], b, capacity);
        uint8_t     *copy = (uint8_t *)malloc(size ? size : 1);     /* its end is guarded */
        require(copy != NULL);
        memcpy(copy, b, size);
        LLVMFuzzerTestOneInput(copy, size);
        free(copy);
    }
    free(b);
    printf("%s: %d files replayed\n", name, n);
    return 0;
}

#endif
#endif
