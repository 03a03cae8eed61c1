/* chains.h - chains of poses, simulated one after the other: the work of 02_data.c.
 * SPDX-License-Identifier: MIT
 *
 *     job         j = chains_job("out/shirt/");       then chains, moves, poses, edge, shard ..
 *     const char *error = chains_dress(&j);
 *     if (!error) error = chains_make(&j);            its shard of the chains
 *     if (!error) error = chains_merge(&j);           all of them into out/shirt/data
 *     chains_free(&j);
 */
#ifndef KDSM_EXAMPLE_CHAINS_H
#define KDSM_EXAMPLE_CHAINS_H

#include "garment.h"
#include "data.h"
#include <time.h>

#define CHAINS_STEPS 40     /* of 1/60 s to each pose: half of them on the way          */
#define CHAINS_MOVE  150    /* of 1/60 s, of a motion at random                         */
#define CHAINS_PASS  30     /* from pose to pose of it, where it is no walk             */

typedef struct job {
    const char *stem;       /* of the files' names: "out/shirt/", "out/02_"             */
    double      edge;       /* m, of the shirt by formula                               */
    double      around;     /* > 0: poses near a walk, 1: as far as a person can        */
    int         chains, poses, steps, every, shard, shards, merge;
    int         moves;      /* motions at random, each a chain more behind those of poses */
    int         move;       /* steps of each                                            */
    int         motions;    /* of files, each a chain more, behind all at random        */
    char      **files;      /* GARMENT BODY WEIGHTS MOTION ..                           */
    const char *skeleton;   /* of that body, for random angles; else NULL               */
    figure      f;
    garment     g;
    double     *u, T[2 * 12 * 1000];                /* joints now, a step before        */
    FILE       *out;        /* of the chain                                             */
    int         n, thrown;  /* of it                                                    */
    int         joints, vertices;                   /* of chain 0, in merging           */
    char        said[1200]; /* what is wrong with a chain                               */
} job;

/* A job for one process: two chains of two poses of a shirt with edges of 3 cm. */
static inline job chains_job(const char *stem) {
    job j;
    memset(&j, 0, sizeof j);
    j.stem = stem, j.edge = 0.03, j.chains = j.poses = 2, j.shards = 1, j.steps = CHAINS_STEPS;
    j.every = 12, j.move = CHAINS_MOVE;
    return j;
}

static inline const char *chains_keep(job *j, int chain, int number) {
    const int id[2] = {chain, number}, inside = garment_inside(&j->g);
    if (inside < 0) return "the body has no distance grid";
    if (inside > 0) j->thrown++;
    else if (!data_write(j->out, j->f.njoints, j->g.nv, id, j->T, garment_x(&j->g)))
        return "an example cannot be written";
    else j->n++;
    return NULL;
}

static inline int chains_count(const job *j) { return j->chains + j->moves + j->motions; }

/* Before the joints move on: where they are is where they were. */
static inline void chains_before(job *j) {
    const size_t n = 12 * (size_t)j->f.njoints;
    memcpy(j->T + n, j->T, n * sizeof(double));
}

/* Angles at random; or those of a walk at some time of its stride, and a part of them. */
static inline void chains_aim(const job *j, uint64_t seed, double *to) {
    double turn[SHAPES_BONES][3], shift[3];
    int    i;
    figure_angles(&j->f, seed, j->around > 0 ? j->around : 1, to);
    if (!(j->around > 0) || j->f.skin) return;
    shapes_walk(2 + figure_random(seed, 99), 0, turn, shift);
    for (i = 0; i < 3 * SHAPES_BONES; i++) to[i] += turn[i / 3][i % 3];
}

/* Poses at random, one after the other, each settled. */
static inline const char *chains_poses(job *j, int chain) {
    const char *error = NULL;
    double      from[3 * 1000], to[3 * 1000];
    int         p;
    memset(from, 0, sizeof from);
    for (p = 0; p < j->poses && !error; p++) {
        chains_aim(j, 1000 * (uint64_t)chain + (uint64_t)p + 1, to);
        error = garment_bring(&j->g, from, to, j->steps, j->T);
        chains_before(j);
        if (!error) error = chains_keep(j, chain, p);
        memcpy(from, to, sizeof from);
    }
    return error;
}

/* The joints at step i of a motion at random: a walk at a tempo, of a width and about angles of its
 * own; where there is none, from pose to pose. */
static inline void chains_way(job *j, int chain, int i) {
    const uint64_t seed = 1000 * (uint64_t)chain + 1;
    const double   apart = fmin(0.3, 3 * j->around);
    double         from[3 * 1000], to[3 * 1000], turn[SHAPES_BONES][3], shift[3], t, s;
    int            k;
    if (!(j->around > 0) || j->f.skin) {
        const int pass = i / CHAINS_PASS;
        memset(from, 0, sizeof from);
        if (pass) chains_aim(j, seed + (uint64_t)pass - 1, from);
        chains_aim(j, seed + (uint64_t)pass, to);
        t = (double)(i % CHAINS_PASS) / CHAINS_PASS;
        figure_between(&j->f, from, to, t * t * (3 - 2 * t), j->T);
        return;
    }
    t = i * GARMENT_H, s = fmin(t, 1), s = s * s * (3 - 2 * s);
    figure_angles(&j->f, seed, j->around, to);
    shapes_walk(t * (1 + apart * figure_random(seed, 97)), 0, turn, shift);
    for (k = 0; k < 3 * SHAPES_BONES; k++)
        turn[k / 3][k % 3] = turn[k / 3][k % 3] * (1 + apart * figure_random(seed, 98)) + s * to[k];
    shapes_bones((const double (*)[3])turn, shift, j->T);
}

/* A motion at random, kept while it moves. */
static inline const char *chains_move(job *j, int chain) {
    const char *error = NULL;
    int         i;
    for (i = 1; i <= j->move && !error; i++) {
        chains_before(j);
        chains_way(j, chain, i);
        error = garment_step(&j->g, j->T, 0.1);
        if (!error && i % j->every == 0) error = chains_keep(j, chain, i / j->every - 1);
    }
    return error;
}

/* The number of a motion's examples: of ten motions the first is tested, the second watches. */
static inline int chains_number(int motion) {
    return 1000000 + 10 * (motion / 10) + 9 - motion % 10;
}

static inline const char *chains_motion(job *j, int motion) {
    const char *error = figure_read_motion(j->files[3 + motion], &j->f);
    int         i;
    for (i = 1; !error && 120 * (i - 1) * GARMENT_H < j->f.frames; i++) {
        chains_before(j);
        figure_walk(&j->f, i * GARMENT_H, j->T);
        error = garment_step(&j->g, j->T, 0.1);
        if (!error && i % j->every == 0)
            error = chains_keep(j, chains_number(motion), i / j->every - 1);
    }
    return error;
}

static inline void chains_part(const job *j, int chain, const char *end, char *path) {
    sprintf(path, "%.900schain_%05d.%s", j->stem, chain, end);
}

/* One chain into its file; where that is there already, nothing. */
static inline const char *chains_one(job *j, int chain) {
    char        part[1000], done[1000];
    const char *error;
    chains_part(j, chain, "part", part), chains_part(j, chain, "done", done);
    if ((j->out = fopen(done, "rb")) != NULL) {
        fclose(j->out);
        return NULL;
    }
    if ((j->out = fopen(part, "wb")) == NULL) return "the directory cannot be written";
    j->n = j->thrown = 0;
    figure_walk(&j->f, 0, j->T);
    error = garment_wear(&j->g, j->T);
    if (!error && !data_write_head(j->out, j->f.njoints, j->g.nv, 0, 0, j->u))
        error = "a chain cannot be written";
    if (!error)
        error = chain < j->chains ? chains_poses(j, chain)
                : chain < j->chains + j->moves ? chains_move(j, chain)
                : chains_motion(j, chain - j->chains - j->moves);
    rewind(j->out);                         /* what it holds is known only now */
    if (!error && !data_write_head(j->out, j->f.njoints, j->g.nv, j->n, j->thrown, j->u))
        error = "a chain cannot be written";
    if (fclose(j->out) && !error) error = "a chain cannot be written";
    if (!error && rename(part, done)) error = "a chain cannot be renamed";
    return error;
}

/* Chain c as it was kept; all are of the joints and vertices of chain 0. */
static inline const char *chains_read(job *j, int c, data_set *s) {
    char        path[1000];
    const char *error;
    chains_part(j, c, "done", path);
    error = data_read(path, s);
    if (error) sprintf(j->said, "%s: %s", path, error);
    if (error) return j->said;
    if (c == 0) j->joints = s->njoints, j->vertices = s->nv;
    if (s->njoints == j->joints && s->nv == j->vertices) return NULL;
    sprintf(j->said, "%s: %d joints and %d vertices, chain 0 %d and %d", path, s->njoints, s->nv,
            j->joints, j->vertices);
    return j->said;
}

static inline const char *chains_write(job *j, FILE *out, int n, int thrown, data_set *s) {
    const char *error = NULL;
    int         c, i;
    for (c = 0; c < chains_count(j) && !error; c++) {
        error = chains_read(j, c, s);
        if (!error && c == 0 && !data_write_head(out, s->njoints, s->nv, n, thrown, s->u))
            error = "no space";
        for (i = 0; i < s->n && !error; i++)
            if (!data_write(out, s->njoints, s->nv, s->id[i],
                            s->T + (size_t)i * (size_t)s->njoints * 24,
                            s->x + (size_t)i * (size_t)s->nv * 3)) error = "no space";
    }
    return error;
}

/* All chains into one file, in their order; where one fails the file is as before. */
static inline const char *chains_merge(job *j) {
    data_set    s;
    char        part[1000], path[1000];
    const char *error = NULL;
    FILE       *out;
    int         c, n = 0, thrown = 0;
    memset(&s, 0, sizeof s);
    for (c = 0; c < chains_count(j) && !error; c++) {
        error = chains_read(j, c, &s);
        n += s.n, thrown += s.thrown;
    }
    sprintf(path, "%.900sdata", j->stem), sprintf(part, "%.900sdata.part", j->stem);
    if (!error && (out = fopen(part, "wb")) == NULL) error = "the directory cannot be written";
    else if (!error) {
        error = chains_write(j, out, n, thrown, &s);
        if (fclose(out) && !error) error = "no space";
        if (error) (void)remove(part);
        else if (rename(part, path)) {      /* not every system renames onto a file */
            (void)remove(path);
            if (rename(part, path)) error = "the merged file cannot be renamed";
        }
    }
    data_free(&s);
    if (!error)
        printf("%d examples of %d chains, %d thrown out\n", n, chains_count(j), thrown);
    return error;
}

/* The body; with a skeleton, what its motions span. */
static inline const char *chains_figure(job *j) {
    const char *error = j->motions ? figure_load(j->files[1], j->files[2], j->files[3], &j->f)
                                   : figure_make(0.03, &j->f);
    int         i;
    if (!error && j->skeleton) error = figure_read_skeleton(j->skeleton, &j->f);
    for (i = 0; i < j->motions && j->skeleton && !error; i++) {
        error = figure_read_motion(j->files[3 + i], &j->f);
        if (!error) figure_widen(&j->f);
    }
    return error;
}

/* The garment, and where it hangs at rest. */
static inline const char *chains_dress(job *j) {
    const char *error = chains_figure(j);
    int         i;
    if (!error) error = j->motions ? garment_load(&j->f, j->files[0], &j->g)
                                   : garment_make(&j->f, j->edge, &j->g);
    if (error) return error;
    figure_walk(&j->f, 0, j->T);
    error = garment_wear(&j->g, j->T);
    for (i = 0; i < j->steps && !error; i++) error = garment_step(&j->g, j->T, 0.1);
    j->u = (double *)malloc(3 * (size_t)j->g.nv * sizeof(double));
    if (!j->u) return "out of memory";
    memcpy(j->u, garment_x(&j->g), 3 * (size_t)j->g.nv * sizeof(double));
    return error;
}

/* The chains of the shard, with a line of progress. */
static inline const char *chains_make(job *j) {
    const char *error = NULL;
    const int   n = chains_count(j);
    int         c, done = 0, all = 0;
    for (c = j->shard; c < n; c += j->shards) all++;
    for (c = j->shard; c < n && !error; c += j->shards) {
        error = chains_one(j, c);
        fprintf(stderr, "\rshard %d/%d: %d of %d chains, %.0f s ", j->shard, j->shards, ++done, all,
                (double)clock() / CLOCKS_PER_SEC);
    }
    if (done) fprintf(stderr, "\n");
    return error;
}

/* Chains that an earlier run left are made anew. */
static inline void chains_forget(const job *j) {
    char path[1000];
    int  c;
    for (c = 0; c < chains_count(j); c++) {
        chains_part(j, c, "done", path);
        (void)remove(path);
    }
}

static inline void chains_free(job *j) {
    garment_free(&j->g), figure_free(&j->f), free(j->u);
    j->u = NULL;
}

#endif
