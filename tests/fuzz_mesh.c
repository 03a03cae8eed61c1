/* fuzz_mesh.c - random bytes as OBJ text, then check, topology, flattening, writing.
 *   clang -g -O1 -fsanitize=fuzzer,address,undefined -I.. fuzz_mesh.c -o fuzz_mesh -lm
 *   ./fuzz_mesh -max_total_time=600 -max_len=4096 corpus/
 * Without libFuzzer, files are replayed, or seeds mutated for N seconds:
 *   cc -std=c99 -g -O1 -fsanitize=address,undefined -DFUZZ_MAIN -I.. fuzz_mesh.c -o fuzz_mesh -lm
 *   ./fuzz_mesh file ...        ./fuzz_mesh -N [seed file ...]
 * Aborts when a promise is broken: a mesh exactly with CLOTH_OK, no line logged as an error with
 * CLOTH_OK and one at least without, topology refused exactly when the check finds such a fault,
 * the text written read back as the same mesh, nothing left allocated. */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include <stdio.h>
#include "fuzz.h"

/* Writes the mesh and reads it back. */
static void round_trip(const cloth_hooks *hooks, const cloth_mesh *m, cloth_obj_options opt) {
    cloth_mesh *back = NULL;
    size_t      needed = 0, n = 0;
    char       *text;
    require(cloth_obj_format(hooks, m, NULL, 0, &needed) == CLOTH_OK);
    text = (char *)malloc(needed ? needed : 1);
    require(cloth_obj_format(hooks, m, text, needed, &n) == CLOTH_OK && n == needed);
    opt.scale = 1;
    opt.pattern_scale = m->X && m->nr == 0 ? 1 : 0;
    require(cloth_obj_parse(hooks, text, needed, &opt, &back) == CLOTH_OK);
    require(back->nv == m->nv && back->nf == m->nf && (m->nr == 0 || back->nr == m->nr));
    require(memcmp(back->x, m->x, 3 * sizeof(double) * (size_t)m->nv) == 0);
    require(memcmp(back->faces, m->faces, 3 * sizeof(int) * (size_t)m->nf) == 0);
    if (m->nr > 0)
        require(memcmp(back->render_vertex, m->render_vertex, sizeof(int) * (size_t)m->nr) == 0);
    if (m->nr > 0) require(memcmp(back->vt, m->vt, 2 * sizeof(double) * (size_t)m->nr) == 0);
    if (back->X && opt.pattern_scale > 0)
        require(memcmp(back->X, m->X, 6 * sizeof(double) * (size_t)m->nf) == 0);
    cloth_mesh_destroy(hooks, back);
    free(text);
}

static void use(const cloth_hooks *hooks, host *h, cloth_mesh *m) {
    cloth_mesh_report r;
    cloth_topology   *t = NULL;
    cloth_status      status;
    double           *X = (double *)malloc(6 * sizeof(double) * (size_t)m->nf);
    const int         before = h->errors;
    int               i, fault;
    status = cloth_mesh_check(hooks, m->nv, m->x, m->nf, m->faces, m->X, &r);
    require((status == CLOTH_OK) == (r.errors == 0) && (h->errors > before) == (r.errors > 0));
    fault = r.count[CLOTH_MESH_INDEX] + r.count[CLOTH_MESH_REPEATED] +
            r.count[CLOTH_MESH_DUPLICATE] + r.count[CLOTH_MESH_THREE_FACES] +
            r.count[CLOTH_MESH_ORIENTATION];
    status = cloth_topology_create(hooks, m->nv, m->nf, m->faces, &t);
    require(status == (fault ? CLOTH_ERR_MESH : CLOTH_OK) && (t != NULL) == !fault);
    if (t) {
        require(t->loop_start[t->nloop] == t->ne - t->nh);
        require(2 * t->nh + (t->ne - t->nh) == 3 * m->nf);
    }
    cloth_topology_destroy(hooks, t);
    status = cloth_flatten(m->nv, m->x, m->nf, m->faces, X);
    fault = r.count[CLOTH_MESH_REPEATED] + r.count[CLOTH_MESH_ZERO_AREA];
    require(status == (fault ? CLOTH_ERR_MESH : CLOTH_OK));
    for (i = 0; status == CLOTH_OK && i < 6 * m->nf; i++) require(clothi_finite(X[i]));
    free(X);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const double scales[] = {0, 1, 0.01, 1e300};
    cloth_obj_options   opt = cloth_obj_options_default();
    host                h;
    cloth_hooks         hooks = fuzz_hooks(&h);
    cloth_mesh         *m = NULL;
    cloth_status        status;
    const unsigned      choice = size > 0 ? data[0] : 0;
    opt.parts = (cloth_obj_parts)(choice % 3u);     /* the first byte also chooses the options */
    opt.pattern_scale = scales[choice / 3u % 4u];
    opt.scale = choice & 64u ? 1e-3 : 1;
    status = cloth_obj_parse(&hooks, (const char *)data, size, &opt, &m);
    require((status == CLOTH_OK) == (m != NULL) && (status == CLOTH_OK) == (h.errors == 0));
    if (m) {
        use(&hooks, &h, m);
        round_trip(&hooks, m, opt);
        m->nr = 0;
        round_trip(&hooks, m, opt);
    }
    cloth_mesh_destroy(&hooks, m);
    require(h.live == 0);
    return 0;
}

#ifdef FUZZ_MAIN

#define FUZZ_MAX 4096

/* Changes one thing: a byte, a stretch removed, repeated or taken from elsewhere, a word. */
static size_t fuzz_mutate(uint8_t *b, size_t n) {
    static const char *const words[] = {
        "v ", "vt ", "f ", "\n", "\r", "\\\n", "/", "//", "-1", "1", "2", "0", "4294967297",
        "g a\n", "o b\n", "nan", "1e999", "1e-999", "0.", ".", "e", "#", "\xef\xbb\xbf",
        "v 0 0 0\n", "f 1 2 3\n", "f -1 -2 -3 -4\n", "1.7976931348623157e308 ", "4.9e-324 ",
        "99999999999999999"};
    const size_t at = fuzz_below(n + 1), len = fuzz_below(n - at + 1) % 64;
    const char  *word = words[fuzz_below(sizeof words / sizeof *words)];
    const size_t w = strlen(word), from = fuzz_below(n - len + 1);
    switch (fuzz_below(6)) {
    case 0: if (at < n) b[at] = (uint8_t)fuzz_below(256); return n;
    case 1: if (at < n) b[at] ^= (uint8_t)(1u << fuzz_below(8)); return n;
    case 2: memmove(b + at, b + at + len, n - at - len); return n - len;
    case 3:
        if (n + len > FUZZ_MAX) return n;
        memmove(b + at + len, b + at, n - at);
        memmove(b + at, b + (from + len <= n ? from : 0), len);
        return n + len;
    case 4:
        if (n + w > FUZZ_MAX) return n;
        memmove(b + at + w, b + at, n - at);
        memcpy(b + at, word, w);
        return n + w;
    default: memmove(b + at, b + from, len); return n;
    }
}

/* Starts from the seeds in turn, up to 30 changes each. An exact copy lets a sanitizer see the
 * end of the text. */
static void fuzz_run(double seconds, int nseed, char **seeds) {
    static const char start[] =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\ng a\n"
        "f 1/1 2/2 3/3\nf 4/4 3/3 2/2\n";
    uint8_t b[FUZZ_MAX];
    long    runs = 0;
    double  begin = fuzz_clock();
    while (fuzz_clock() - begin < seconds) {
        size_t n = sizeof start - 1, changes = 1 + fuzz_below(30);
        memcpy(b, start, n);
        if (nseed > 0 && runs % 4) n = fuzz_read(seeds[runs % nseed], b, FUZZ_MAX);
        while (changes--) {
            uint8_t *copy;
            n = fuzz_mutate(b, n);
            copy = (uint8_t *)malloc(n ? n : 1);
            memcpy(copy, b, n);
            LLVMFuzzerTestOneInput(copy, n);
            free(copy);
            runs++;
        }
    }
    printf("fuzz_mesh: %ld texts, no finding\n", runs);
}

int main(int argc, char **argv) {
    if (argc < 2 || argv[1][0] != '-') return fuzz_replay(argc - 1, argv + 1, "fuzz_mesh");
    fuzz_run(atof(argv[1] + 1), argc - 2, argv + 2);
    return 0;
}

#endif
