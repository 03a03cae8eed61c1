/* data.h - examples of a garment on a body in many poses: the file of 02_data.c.
 * SPDX-License-Identifier: MIT
 *
 * KDSMDAT2, uint32 joints, vertices, examples, thrown out; u [vertices x 3] double, the garment
 * at rest; then each example: int32 chain and its number there, T [2 x joints x 12] now and a step
 * of 1/60 s before, x [vertices x 3] double. Little-endian machines. A chain is one simulation:
 * chains are split, not examples.
 */
#ifndef KDSM_EXAMPLE_DATA_H
#define KDSM_EXAMPLE_DATA_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct data_set {
    int      njoints, nv, n, thrown;
    double  *u;                     /* [nv x 3]                                         */
    int    (*id)[2];                /* [n] chain, number                                */
    double  *T;                     /* [n x 2 x njoints x 12] now, a step before         */
    double  *x;                     /* [n x nv x 3]                                     */
} data_set;

static inline void data_free(data_set *s) {
    free(s->u), free(s->id), free(s->T), free(s->x);
    memset(s, 0, sizeof *s);
}

/* 80 of 100 chains to learn from (0), 10 to watch (1), 10 to test (2). */
static inline int data_split(int chain) {
    return chain % 10 == 8 ? 1 : chain % 10 == 9 ? 2 : 0;
}

static inline int data_write_head(FILE *f, int njoints, int nv, int n, int thrown,
                                  const double *u) {
    const uint32_t head[4] = {(uint32_t)njoints, (uint32_t)nv, (uint32_t)n, (uint32_t)thrown};
    return fwrite("KDSMDAT2", 1, 8, f) == 8 && fwrite(head, 4, 4, f) == 4
           && fwrite(u, 3 * sizeof(double), (size_t)nv, f) == (size_t)nv;
}

static inline int data_write(FILE *f, int njoints, int nv, const int id[2], const double *T,
                             const double *x) {
    const int32_t who[2] = {(int32_t)id[0], (int32_t)id[1]};
    return fwrite(who, 4, 2, f) == 2
           && fwrite(T, 24 * sizeof(double), (size_t)njoints, f) == (size_t)njoints
           && fwrite(x, 3 * sizeof(double), (size_t)nv, f) == (size_t)nv;
}

/* Reads a file; what is in *s before is freed. NULL or what is wrong. */
static inline const char *data_read(const char *path, data_set *s) {
    char        magic[8];
    uint32_t    head[4];
    const char *error = "not a file of 02_data, or cut short";
    FILE       *f = fopen(path, "rb");
    size_t      i, j, v;
    data_free(s);
    if (!f) return "the file of examples cannot be opened";
    if (fread(magic, 1, 8, f) != 8 || memcmp(magic, "KDSMDAT2", 8) != 0) goto done;
    if (fread(head, 4, 4, f) != 4) goto done;
    if (head[0] < 1 || head[0] > 1000 || head[1] < 1 || head[1] > 1000000) goto done;
    if (head[2] > 1000000) goto done;
    s->njoints = (int)head[0], s->nv = (int)head[1], s->thrown = (int)head[3];
    j = 24 * (size_t)head[0], v = 3 * (size_t)head[1];
    s->u = (double *)malloc(v * sizeof(double));
    s->id = (int(*)[2])malloc(((size_t)head[2] + 1) * sizeof *s->id);
    s->T = (double *)malloc((size_t)head[2] * j * sizeof(double) + 1);
    s->x = (double *)malloc((size_t)head[2] * v * sizeof(double) + 1);
    error = "out of memory";
    if (!s->u || !s->id || !s->T || !s->x) goto done;
    error = "the file of examples is cut short";
    if (fread(s->u, sizeof(double), v, f) != v) goto done;
    for (i = 0; i < head[2]; i++) {
        int32_t who[2];
        if (fread(who, 4, 2, f) != 2) goto done;
        s->id[i][0] = (int)who[0], s->id[i][1] = (int)who[1];
        if (fread(s->T + i * j, sizeof(double), j, f) != j) goto done;
        if (fread(s->x + i * v, sizeof(double), v, f) != v) goto done;
    }
    error = "the file of examples is longer than its head says";
    if (fgetc(f) != EOF) goto done;
    s->n = (int)head[2];
    error = NULL;
done:
    fclose(f);
    if (error) data_free(s);
    return error;
}

#endif
