/* test.h - CHECK, CHECK_NEAR, CHECK_REL, OPEN, RUN, SKIP. Include in one .c file per program.
 *   int main(int argc, char **argv) { TEST_BEGIN(argc, argv); RUN(name); ... return TEST_END(); }
 * argv[1]: run only the tests whose name contains it. Environment: FULL=1, test_full() is true;
 * QUICK=1, test_quick() is true. The last line that a program prints is
 * 'file.c: N passed, N failed, N skipped (S s)', CPU seconds; a test counts once.
 *
 * A bound that the kit ought to hold and does not hold yet is OPEN in the place of CHECK:
 *   OPEN(worst <= 1, "worst %.1f %% (at most 1)", worst);      OPEN_MOST(worst, 1, "worst %");
 * Where it does not hold the test prints 'open: FIGURE (bound)', counts as skipped and is named in
 * the last lines of the suite; where it holds the test passes as with CHECK. A test that fails is
 * failed and not open: its figures are printed after 'beyond: ' then. */
#ifndef CLOTH_TEST_H
#define CLOTH_TEST_H

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* C's NAN and INFINITY are floats; clang warns wherever one becomes a double */
#ifdef __clang__
#undef NAN
#undef INFINITY
#define NAN      __builtin_nan("")
#define INFINITY __builtin_inf()
#endif

static const char *test_program, *test_filter, *test_name;
static int test_passed, test_failed, test_skipped, test_bad, test_skip;
static int test_open;                       /* figures beyond an open bound                    */
static char test_beyond[4096];              /* those, a line each                              */
static clock_t test_clock;

#define CHECK(cond) test_true((cond) ? 1 : 0, #cond, __FILE__, __LINE__)
/* |a - b| <= tol; NaN fails */
#define CHECK_NEAR(a, b, tol)                                                                    \
    test_near((double)(a), (double)(b), (double)(tol), #a, __FILE__, __LINE__)
/* |a - b| <= rel * max(|a|, |b|) */
#define CHECK_REL(a, b, rel)                                                                     \
    test_near((double)(a), (double)(b), (double)(rel) * fmax(fabs((double)(a)),                  \
                                                             fabs((double)(b))),                 \
              #a, __FILE__, __LINE__)
/* what may be beyond its bound; the rest, as for printf, says the figure and (the bound) */
#define OPEN(cond, ...)                                                                          \
    do {                                                                                         \
        if (!(cond)) test_leave_open(__VA_ARGS__);                                               \
    } while (0)
/* value <= bound; NaN is beyond */
#define OPEN_MOST(value, bound, what)                                                            \
    OPEN((double)(value) <= (double)(bound), "%s %.4g (at most %.4g)", what, (double)(value),    \
         (double)(bound))
#define RUN(name)                                                                                \
    do {                                                                                         \
        if (test_start(#name)) {                                                                 \
            name();                                                                              \
            test_stop();                                                                         \
        }                                                                                        \
    } while (0)
#define SKIP(why)                                                                                \
    do {                                                                                         \
        test_skip = 1;                                                                           \
        printf("  %s: skipped: %s\n", test_name, why);                                           \
        return;                                                                                  \
    } while (0)
#define TEST_BEGIN(argc, argv) test_begin(argc, argv, __FILE__)
#define TEST_END() test_end()

static int test_true(int good, const char *what, const char *file, int line) {
    if (good) return 1;
    printf("%s:%d: %s: failed: %s\n", file, line, test_name, what);
    test_bad++;
    return 0;
}

static int test_near(double a, double b, double tol, const char *what, const char *file,
                     int line) {
    if (fabs(a - b) <= tol) return 1;
    printf("%s:%d: %s: %s = %.17g, expected %.17g within %.3g\n", file, line, test_name, what, a,
           b, tol);
    test_bad++;
    return 0;
}

static inline void test_leave_open(const char *format, ...) {
    const size_t used = strlen(test_beyond);
    va_list      list;
    test_open++;
    if (used + 2 >= sizeof test_beyond) return;
    va_start(list, format);
    (void)vsnprintf(test_beyond + used, sizeof test_beyond - used - 1, format, list);
    va_end(list);
    strcat(test_beyond, "\n");
}

/* what was left open, a line each: behind 'open: ' only where nothing failed */
static void test_say_open(void) {
    char *line = test_beyond, *end;
    for (; (end = strchr(line, '\n')) != NULL; line = end + 1)
        printf("  %s: %s: %.*s\n", test_name, test_bad ? "beyond" : "open", (int)(end - line),
               line);
}

static int test_start(const char *name) {
    test_name = name;
    test_bad = test_skip = test_open = 0;
    test_beyond[0] = 0;
    test_clock = clock();
    return !test_filter || strstr(name, test_filter) != NULL;
}

static void test_stop(void) {
    if (test_bad) test_failed++;
    else if (test_skip || test_open) test_skipped++;
    else test_passed++;
    test_say_open();
    if (test_bad) printf("  %s: FAILED (%d checks)\n", test_name, test_bad);
    else if (!test_skip && !test_open)
        printf("  %s: ok (%.2f s)\n", test_name,
               (double)(clock() - test_clock) / CLOCKS_PER_SEC);
    fflush(stdout);                         /* what was said survives a crash of the next test */
}

static void test_begin(int argc, char **argv, const char *file) {
    test_program = strrchr(file, '/') ? strrchr(file, '/') + 1 : file;
    test_filter = argc > 1 ? argv[1] : NULL;
    (void)test_near;
    (void)test_true;
}

static int test_end(void) {
    printf("%s: %d passed, %d failed, %d skipped (%.2f s)\n", test_program, test_passed,
           test_failed, test_skipped, (double)clock() / CLOCKS_PER_SEC);
    fflush(stdout);
    return test_failed != 0;
}

/* true in the long tier: make -C tests full */
static inline int test_full(void) {
    const char *full = getenv("FULL");
    return full && *full == '1';
}

/* true in the short tier: make -C tests quick */
static inline int test_quick(void) {
    const char *quick = getenv("QUICK");
    return quick && *quick == '1';
}

/* false where long double is no wider than double, as under valgrind: no reference then */
static inline int test_long_double(void) {
    volatile long double one = 1, more = one + 1e-18L;
    return more > one;
}

/* A file of the shared data directory (beside the checkout, or $CLOTH_SHARED), "" when absent. */
static inline const char *test_shared(const char *name) {
    static char path[1024];
    const char *root = getenv("CLOTH_SHARED");
    FILE       *f;
    snprintf(path, sizeof path, "%s/%s", root ? root : "../../shared", name);
    f = fopen(path, "rb");
    if (!f) return "";
    fclose(f);
    return path;
}

#endif
