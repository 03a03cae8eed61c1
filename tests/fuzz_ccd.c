/* fuzz_ccd.c - random bytes as moving pairs, then detection, distance and contact frame.
 *   clang -g -O1 -ffp-contract=off -fsanitize=fuzzer,address,undefined -I.. fuzz_ccd.c \
 *       -o fuzz_ccd -lm
 *   ./fuzz_ccd -max_total_time=600 -max_len=256 corpus/
 * Without libFuzzer, files are replayed, or seeds mutated for N seconds:
 *   cc -std=c99 -g -O1 -ffp-contract=off -fsanitize=address,undefined -DFUZZ_MAIN -I.. \
 *       fuzz_ccd.c -o fuzz_ccd -lm
 *   ./fuzz_ccd file ...        ./fuzz_ccd -N [seed file ...]
 * Aborts when a promise is broken: an answer of 0 or 1 with its time, a pair that is within
 * min_sep at a sampled time found no later than then, no pair within min_sep before the time
 * given, numbers that are not finite answered with 1 and 0, a normal of unit length. */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "fuzz.h"
#include "ccd.h"

/* The first byte: kind, size of the numbers, separation; then 24 small integers, or doubles. */
static int decode(const uint8_t *data, size_t size, double *x, double *sep) {
    static const double seps[] = {0, 0.25, 1e-3, 1e-12};
    static const double scales[] = {1, 0x1p-30, 0x1p60, 0x1p-900};
    const int           flags = size > 0 ? data[0] : 0;
    double              scale = scales[flags >> 4 & 3];
    int                 i;
    for (i = 0; i < 24; i++) {
        x[i] = 0;
        if (flags & 2 && 9 + 8 * (size_t)i <= size) memcpy(x + i, data + 1 + 8 * i, 8);
        else if (1 + (size_t)i < size) x[i] = scale * ((int)data[1 + i] - 128) / 16;
    }
    if (flags & 2) scale = ccd_size(x);
    *sep = seps[flags >> 2 & 3] * scale;
    return flags & 1;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    double    x[24], w[4], n[3], sep, toi = -1, m;
    const int ee = decode(data, size, x, &sep);
    double    least = HUGE_VAL;
    int       i, hit, finite = clothi_finite(sep);
    for (i = 0; i < 24; i++) {
        finite = finite && clothi_finite(x[i]);
        if (fabs(x[i]) > 0 && fabs(x[i]) < least) least = fabs(x[i]);
    }
    hit = ccd_call(ee, x, sep, &toi);
    require(hit == 0 || hit == 1);
    require(hit ? toi >= 0 && toi <= 1 : toi >= 1 && toi <= 1);
    if (!finite) {
        require(hit && toi <= 0);
        return 0;
    }
    m = ccd_size(x);
    for (i = 0; i <= 64; i++) {
        const ref_real t = (ref_real)i / 64, d = ccd_distance(ee, x, t);
        const ref_real noise = 1e-15L * (ref_real)m;        /* of d in long double, thin shapes */
        /* a zero is one where the reference holds every number beside every other */
        if ((d == 0 && least > 1e-15 * m) || d + noise < (ref_real)sep)
            require(hit && (ref_real)toi <= t);
        if (hit && t < (ref_real)toi) require(d + noise > (ref_real)sep);
    }
    if (m < 1e300) {
        const double d = clothi_pair_distance(ee, x, w);
        require(d >= 0 && clothi_finite(d));
        require(fabs((double)(((ref_real)d - ccd_distance(ee, x, 0)))) <= 1e-8 * m);
        require(clothi_contact_frame(ee, x, x + 12, toi, w, n) >= 0);
        require(fabs(clothi_dot3(n, n) - 1) < 1e-9 && fabs(w[0] + w[1] + w[2] + w[3]) < 1e-12);
    }
    return 0;
}

#ifdef FUZZ_MAIN

#define FUZZ_MAX 256

/* Changes one thing: a byte, a coordinate made equal to another, a double by one ulp. */
static void fuzz_mutate(uint8_t *b) {
    const size_t at = fuzz_below(193), wide = 1 + 8 * fuzz_below(24), from = 1 + 8 * fuzz_below(24);
    const double small = ldexp((double)fuzz_below(9) - 4, (int)fuzz_below(60) - 50);
    uint64_t     bits;
    switch (fuzz_below(7)) {
    case 0: b[at] = (uint8_t)fuzz_below(256); break;
    case 1: b[at] ^= (uint8_t)(1u << fuzz_below(8)); break;
    case 2: b[0] = (uint8_t)fuzz_below(256); break;
    case 3: memmove(b + wide, b + from, 8); break;
    case 4: b[1 + fuzz_below(24)] = b[1 + fuzz_below(24)]; break;
    case 5: memcpy(b + wide, &small, 8); break;
    default:
        memcpy(&bits, b + wide, 8);
        bits += fuzz_below(3);
        bits--;
        memcpy(b + wide, &bits, 8);
        break;
    }
}

static void fuzz_run(double seconds, int nseed, char **seeds) {
    uint8_t b[FUZZ_MAX];
    long    runs = 0;
    double  begin = fuzz_clock();
    while (fuzz_clock() - begin < seconds) {
        size_t i, changes = 1 + fuzz_below(200);
        memset(b, 0, sizeof b);
        if (nseed > 0 && runs % 4) (void)fuzz_read(seeds[runs % nseed], b, FUZZ_MAX);
        else
            for (i = 0; i < 25; i++) b[i] = (uint8_t)(i ? 128 + 16 * (fuzz_below(5) - 2) : 0);
        while (changes--) {
            fuzz_mutate(b);
            LLVMFuzzerTestOneInput(b, 193);
            runs++;
        }
    }
    printf("fuzz_ccd: %ld pairs, no finding\n", runs);
}

int main(int argc, char **argv) {
    if (argc < 2 || argv[1][0] != '-') return fuzz_replay(argc - 1, argv + 1, "fuzz_ccd");
    fuzz_run(atof(argv[1] + 1), argc - 2, argv + 2);
    return 0;
}

#endif
