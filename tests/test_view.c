/* test_view.c - the pages and charts of the examples: numbers that no picture can hold are held,
 * left out and counted, and none gets into the file.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_view.c -lm && ./a.out */
#include "../examples/plot.h"
#include "../examples/view.h"
#include "test.h"

/* What the file holds; NULL: it cannot be opened. To be freed. */
static char *contents(const char *path) {
    FILE  *f = fopen(path, "rb");
    char  *text = (char *)calloc(1 << 20, 1);
    size_t n = 0;
    if (f && text) n = fread(text, 1, (1 << 20) - 1, f), fclose(f);
    if (n) return text;
    free(text);
    return NULL;
}

/* Coordinates and scalars of a frame; those beyond 1e30 are held. The page holds this program's
 * text too: what is looked for is no word of it. */
static void page_of_large_numbers(void) {
    static const double far[6] = {1e30, 1.1e30, 1e39, -1e39, 1e300, (double)INFINITY};
    const int           face[3] = {0, 1, 2};
    int                 k;
    for (k = 0; k < 6; k++) {
        double      x[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, s[3] = {1, 1, 1};
        const char *error;
        char       *text;
        view       *v = view_open("large", "");
        view_mesh(v, "m", VIEW_CLOTH, 3, 1, face);
        view_scalar(v, 0, "s", "", VIEW_VERTEX, 0, 1, 2);
        view_time(v, 0), view_put(v, 0, x, s, NULL);
        x[4] = s[1] = far[k];
        view_time(v, 1), view_put(v, 0, x, s, NULL);
        error = view_close(v, "out/test_view.html");
        text = contents("out/test_view.html");
        if (error && !text) SKIP("there is no directory out");
        CHECK(error == NULL && text);
        if (!text) return;
        CHECK(!strstr(text, ":" "inf") && !strstr(text, "[" "inf") && !strstr(text, "," "inf"));
        CHECK(!strstr(text, ":-" "inf") && !strstr(text, "[-" "inf"));
        CHECK((strstr(text, "2 values were not " "finite or beyond 1e30") != NULL) == (k > 0));
        free(text);
    }
    (void)remove("out/test_view.html"), (void)remove("out/test_view.png");
}

/* A middle that is none parts no scale; one that the page cannot hold is refused, as an end is. */
static void scale_of_large_numbers(void) {
    static const double mid[5] = {(double)INFINITY, (double)NAN, 1e30, 1e300, 1};
    const int           face[3] = {0, 1, 2};
    int                 k;
    for (k = 0; k < 5; k++) {
        double x[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, s[3] = {1, 1, 1};
        view  *v = view_open("scale", "");
        view_mesh(v, "m", VIEW_CLOTH, 3, 1, face);
        view_scalar(v, 0, "s", "", VIEW_VERTEX, 0, mid[k], k < 4 ? 2 : 1e31);
        view_time(v, 0), view_put(v, 0, x, s, NULL);
        CHECK((v->error != NULL) == (k > 2));
        view_free(v);
    }
}

/* Ends of an axis apart by more than a double holds; on the other axis and by logarithm. */
static void chart_of_large_numbers(void) {
    int k;
    for (k = 0; k < 8; k++) {
        const double least = k & 4 ? 1e-300 : -1e308, size = k & 2 ? 1e300 : 1e308;
        const char  *error;
        char        *text;
        plot        *p = plot_open("large", "a", "b");
        const int    one = plot_series(p, "c");
        plot_axes(p, k & 4 && !(k & 1), k & 4 && k & 1);
        plot_point(p, one, k & 1 ? 1 : fmax(least, -size), k & 1 ? fmax(least, -size) : 1, NULL);
        plot_point(p, one, k & 1 ? 2 : size, k & 1 ? size : 2, "far");
        plot_fit(p, one);
        error = plot_close(p, "out/test_view.svg");
        text = contents("out/test_view.svg");
        if (error && !text) SKIP("there is no directory out");
        CHECK(error == NULL && text);
        if (!text) return;
        CHECK(!strstr(text, "nan") && !strstr(text, "inf"));
        free(text);
    }
    (void)remove("out/test_view.svg");
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(page_of_large_numbers);
    RUN(scale_of_large_numbers);
    RUN(chart_of_large_numbers);
    return TEST_END();
}
