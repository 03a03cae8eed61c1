/* body.h - the scanned walk of the shared data: body.obj skinned by walk_02_01.skin, for tests.
 *   body b;  if (!body_load(&b)) SKIP("...");  body_pose(&b, frame, x);  body_free(&b);
 * Include after clothsim.h and test.h, in one .c file per program. */
#ifndef CLOTH_TEST_BODY_H
#define CLOTH_TEST_BODY_H

#include <stdint.h>

typedef struct body {
    cloth_mesh *mesh;
    int         frames, joints, nw;
    int        *vertex, *joint;             /* [nw] sorted by vertex                           */
    double     *weight;                     /* [nw]                                            */
    float      *skin;                       /* [frames x joints x 12] row-major 3 x 4          */
} body;

static inline void body_free(body *b) {
    cloth_mesh_destroy(NULL, b->mesh);
    free(b->vertex);
    free(b->joint);
    free(b->weight);
    free(b->skin);
    memset(b, 0, sizeof *b);
}

static inline int body_read_weights(body *b, FILE *f) {
    const int most = 65536;
    char      line[256];
    b->vertex = (int *)malloc((size_t)most * sizeof(int));
    b->joint = (int *)malloc((size_t)most * sizeof(int));
    b->weight = (double *)malloc((size_t)most * sizeof(double));
    if (!b->vertex || !b->joint || !b->weight) return 0;
    while (b->nw < most && fgets(line, sizeof line, f))
        b->nw += sscanf(line, "%d %d %lf", &b->vertex[b->nw], &b->joint[b->nw],
                        &b->weight[b->nw]) == 3;
    return b->nw > 0;
}

static inline int body_read_skin(body *b, FILE *f) {
    char     magic[8];
    uint32_t head[4];
    size_t   n;
    if (fread(magic, 1, 8, f) != 8 || memcmp(magic, "SKINMAT1", 8) != 0) return 0;
    if (fread(head, 4, 4, f) != 4) return 0;
    b->frames = (int)head[0];
    b->joints = (int)head[1];
    n = (size_t)b->frames * (size_t)b->joints * 12;
    b->skin = (float *)malloc(n * sizeof(float));
    return b->skin && fread(b->skin, sizeof(float), n, f) == n;
}

/* 1, or 0 when the data is not there. */
static inline int body_load(body *b) {
    FILE *f;
    int   ok;
    memset(b, 0, sizeof *b);
    if (cloth_obj_load(NULL, test_shared("data/body/body.obj"), NULL, &b->mesh) != CLOTH_OK)
        return 0;
    f = fopen(test_shared("data/body/weights_cmu.txt"), "r");
    ok = f && body_read_weights(b, f);
    if (f) fclose(f);
    f = ok ? fopen(test_shared("data/motion/walk_02_01.skin"), "rb") : NULL;
    ok = f && body_read_skin(b, f);
    if (f) fclose(f);
    if (!ok) body_free(b);
    return ok;
}

/* x [nv x 3] at a frame: sum of w (R x + t). */
static inline void body_pose(const body *b, int frame, double *x) {
    int i, a;
    memset(x, 0, 3 * (size_t)b->mesh->nv * sizeof(double));
    for (i = 0; i < b->nw; i++) {
        const float  *m = b->skin + ((size_t)frame * (size_t)b->joints + (size_t)b->joint[i]) * 12;
        const double *p = b->mesh->x + 3 * b->vertex[i];
        for (a = 0; a < 3; a++)
            x[3 * b->vertex[i] + a] += b->weight[i]
                * ((double)m[4 * a] * p[0] + (double)m[4 * a + 1] * p[1]
                   + (double)m[4 * a + 2] * p[2] + (double)m[4 * a + 3]);
    }
}

#endif
