/* page.c - writes the live page: the head of view_page.h, the module in base64, live.js and the
 * drawing, in one file that needs no network.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. page.c -o page -lm
 *   ./page live.wasm live.js live.c OUT.html */
#include "view.h"

/* The bytes of a file; n: how many. NULL: none. */
static char *slurp(const char *path, size_t *n) {
    FILE *file = fopen(path, "rb");
    char *text = file != NULL ? (char *)calloc(1, VIEW_MAX_BYTES) : NULL;
    *n = text != NULL ? fread(text, 1, VIEW_MAX_BYTES - 1, file) : 0;
    if (file != NULL) fclose(file);
    return text;
}

int main(int argc, char **argv) {
    static const char digit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    size_t            n[3];
    char             *text[3], four[4];
    view_buffer       out;
    const char       *error;
    if (argc != 5) return 2;
    for (int i = 0; i < 3; i++) if ((text[i] = slurp(argv[1 + i], &n[i])) == NULL) return 1;
    memset(&out, 0, sizeof out);
    out.limit = VIEW_MAX_BYTES;
    for (int i = 0; view_page_head[i] != NULL; i++) view_text(&out, view_page_head[i]);
    view_text(&out, "const SOURCE = ");
    view_quote(&out, text[2]);
    view_text(&out, ";\nconst WASM = '");
    for (size_t i = 0; i < n[0]; i += 3) {
        unsigned v = 0;
        for (size_t k = i; k < i + 3; k++) v = v << 8 | (k < n[0] ? (unsigned char)text[0][k] : 0u);
        for (int k = 0; k < 4; k++) four[k] = digit[v >> (18 - 6 * k) & 63u];
        if (i + 2 >= n[0]) four[3] = '=';
        if (i + 1 >= n[0]) four[2] = '=';
        view_bytes(&out, four, 4);
    }
    view_text(&out, "';\n");
    view_text(&out, text[1]);
    view_text(&out, "</script>\n<script type='text/plain' id='rest'>\n");
    for (int i = 0; view_page_code[i] != NULL; i++) view_text(&out, view_page_code[i]);
    error = out.failed || out.full ? "out of memory, or too large" : view_save(&out, argv[4]);
    for (int i = 0; i < 3; i++) free(text[i]);
    free(out.p);
    if (error) fprintf(stderr, "%s: %s\n", argv[4], error);
    return error != NULL;
}
