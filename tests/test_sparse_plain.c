/* test_sparse_plain.c - test_sparse.c over the plain loops that serve machines without SSE2.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -DCLOTH_NO_SIMD test_sparse_plain.c -lm
 * tier: full, for it takes long to compile; platforms.sh has such loops in a scene */
#define CLOTHSIM_IMPLEMENTATION
#include "test_sparse.c"
