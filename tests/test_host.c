/* test_host.c - the random host of fuzz_host.c for a few seconds, always the same one: calls of all
 * kinds in any order, and what must be true after each. FULL=1: for minutes.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_host.c -lm
 * tier: quick */
#include "../clothsim_collide.h"
#include "test.h"
#include "fuzz_host.c"

/* Bytes below `plain` stand for nothing absurd. */
static void random_host(unsigned plain, uint64_t seed) {
    const int n = test_full() ? 5000 : 100;
    int       i, k;
    for (i = 0; i < n; i++) {
        uint8_t b[FUZZ_HEAD + FUZZ_SLICE * FUZZ_CALLS];
        for (k = 0; k < (int)sizeof b; k++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            b[k] = (uint8_t)((seed >> 33) % plain);
        }
        CHECK(LLVMFuzzerTestOneInput(b, sizeof b) == 0);
    }
}

static void plain_host(void) { random_host(236, 1); }
static void absurd_host(void) { random_host(256, 2); }

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(plain_host);
    RUN(absurd_host);
    return TEST_END();
}
