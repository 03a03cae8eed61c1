/* test_ccd.c - continuous detection: the public queries, hard ones, closed forms, and random
 * motions against distances sampled in long double.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_ccd.c -lm -o test_ccd && ./test_ccd */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "ccd.h"

/* ---- the public queries */

typedef struct tally {
    int    missed, alarms, apart, late, timed;
    double early;                           /* the most                                         */
} tally;

static void judge(tally *s, const ccd_query *q, const double *x) {
    double    toi = -1;
    const int hit = ccd_call(q->ee, x, 0, &toi);
    s->missed += q->truth && !hit;
    s->apart += !q->truth;
    s->alarms += !q->truth && hit;
    if (hit && !(toi >= 0 && toi <= 1)) s->late++;
    if (q->truth && q->toi >= 0) {
        s->timed++;
        s->late += !(toi <= q->toi);
        s->early = fmax(s->early, q->toi - toi);
    }
}

static void verdict(const char *name, const tally *s) {
    printf("  %-12s missed %d; false alarms %d of %d (%.2f %%); late %d of %d; early by at most "
           "%.1e\n", name, s->missed, s->alarms, s->apart, 100.0 * s->alarms / s->apart, s->late,
           s->timed, s->early);
    CHECK(s->missed == 0);
    CHECK(s->late == 0);
    CHECK(s->alarms <= 0.01 * s->apart);
    CHECK(s->early < 1e-8);
}

static void public_queries(void) {
    int        n, i;
    ccd_query *q = ccd_load(&n);
    ccd_chart  chart;
    tally      s;
    clock_t    begin;
    if (!q) SKIP("no ../shared/data/ccd");
    memset(&chart, 0, sizeof chart);
    memset(&s, 0, sizeof s);
    begin = clock();
    for (i = 0; i < n; i++) judge(&s, q + i, q[i].x);
    printf("  %d queries, %.2f us each\n", n, 1e6 * (double)(clock() - begin) / CLOCKS_PER_SEC / n);
    verdict("as stored", &s);
    CHECK(n > 45000 && s.timed > 14000 && s.apart > 2500);
    for (i = 0; i < n && !test_quick(); i++)
        if (!q[i].truth) {
            double toi;
            ccd_chart_add(&chart, q + i, ccd_call(q[i].ee, q[i].x, 0, &toi));
        }
    ccd_chart_print(&chart);
    free(q);
}

/* Exchanges points a and b at both times. */
static void exchange(double *x, int a, int b) {
    int i, k;
    for (i = 0; i < 24; i += 12)
        for (k = 0; k < 3; k++) {
            const double keep = x[i + 3 * a + k];
            x[i + 3 * a + k] = x[i + 3 * b + k];
            x[i + 3 * b + k] = keep;
        }
}

/* The face's corners in all orders; the edges' ends and the edges exchanged. */
static void permuted(void) {
    int        n, i, way;
    ccd_query *q = ccd_load(&n);
    tally      s;
    if (!q) SKIP("no ../shared/data/ccd");
    memset(&s, 0, sizeof s);
    for (i = 0; i < n; i += test_quick() ? 5 : 1)
        for (way = 1; way < (q[i].ee ? 8 : 6); way++) {
            double x[24];
            if (!test_full() && (i + way) % 4) continue;
            memcpy(x, q[i].x, sizeof x);
            if (q[i].ee) {
                if (way & 1) exchange(x, 0, 1);
                if (way & 2) exchange(x, 2, 3);
                if (way & 4) exchange(x, 0, 2), exchange(x, 1, 3);
            } else {
                if (way & 1) exchange(x, 1, 2);
                if (way / 2 == 1) exchange(x, 1, 3);
                if (way / 2 == 2) exchange(x, 2, 3);
            }
            judge(&s, q + i, x);
        }
    verdict("permuted", &s);
    free(q);
}

static void scaled(void) {
    int        n, i, j, k;
    ccd_query *q = ccd_load(&n);
    static const int powers[] = {10, -10, 200, -200, 1000};
    if (!q) SKIP("no ../shared/data/ccd");
    for (k = 0; k < 5; k++) {
        char  name[32];
        tally s;
        memset(&s, 0, sizeof s);
        for (i = k; i < n; i += test_full() ? 1 : 5) {
            double x[24];
            for (j = 0; j < 24; j++) x[j] = ldexp(q[i].x[j], powers[k]);
            judge(&s, q + i, x);
        }
        snprintf(name, sizeof name, "by 2^%d", powers[k]);
        verdict(name, &s);
    }
    free(q);
}

/* The largest power of two that can be added to one axis without rounding, 0: none. */
static double shift(const double *x, int axis) {
    int e, i;
    for (e = 20; e >= -20; e--) {
        const double s = ldexp(1, e);
        for (i = axis; i < 24; i += 3) {
            double sum, rest;
            clothi_two_sum(x[i], s, &sum, &rest);
            if (rest != 0) break;
        }
        if (i >= 24) return s;
    }
    return 0;
}

static void translated(void) {
    int        n, i, j, moved = 0;
    ccd_query *q = ccd_load(&n);
    tally      s;
    if (!q) SKIP("no ../shared/data/ccd");
    memset(&s, 0, sizeof s);
    for (i = 0; i < n; i++) {
        double    x[24], by[3];
        for (j = 0; j < 3; j++) by[j] = shift(q[i].x, j);
        for (j = 0; j < 24; j++) x[j] = q[i].x[j] + by[j % 3];
        if (by[0] + by[1] + by[2] > 0) judge(&s, q + i, x), moved++;
    }
    printf("  %d of %d can be moved exactly\n", moved, n);
    verdict("translated", &s);
    CHECK(moved > 5000);
    free(q);
}

/* ---- hard queries with known answers */

typedef struct hard {
    const char *name;
    int         ee, hit;
    double      toi;                        /* of the touch                                     */
    double      x[24];
} hard;

static const hard hard_ones[] = {
    {"vertex falls on a face", 0, 1, 0.5, {.25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                           .25, .25, -1, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"stops on the face", 0, 1, 1, {.25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                    .25, .25, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"stops just above", 0, 0, 1, {.25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                   .25, .25, 1e-13, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"starts on the face and leaves", 0, 1, 0, {.25, .25, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                                .25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"rests on the face", 0, 1, 0, {.25, .25, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                    .25, .25, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"nothing moves", 0, 0, 1, {.25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                .25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"in the plane, into a side", 0, 1, 0.5, {-1, .25, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                              1, .25, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"in the plane, onto a corner", 0, 1, 0.5, {-1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                                1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"in the plane, past a corner", 0, 0, 1, {-1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                              1, 1.0009765625, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"on a corner", 0, 1, 0.5, {1, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                1, 0, -1, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"on a side", 0, 1, 0.25, {.5, .5, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                               .5, .5, -3, 0, 0, 0, 1, 0, 0, 0, 1, 0}},
    {"one ulp beside the side", 0, 0, 1, {.5, .5000000000000001, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                                          .5, .5000000000000001, -3, 0, 0, 0, 1, 0, 0, 0, 1,
                                          0}},
    {"grazes the face, a double root", 0, 1, 0.5,        /* the gap is (2t-1)^2 / 4 */
     {-.25, 0, 0, -1, -1, -1, 1, -1, 1, 0, 1, 0, .25, 0, 0, -1, -1, 1, 1, -1, -1, 0, 1, 0}},
    {"grazes by too little", 0, 0, 1,
     {-.25, 0, 1e-13, -1, -1, -1, 1, -1, 1, 0, 1, 0,
      .25, 0, 1e-13, -1, -1, 1, 1, -1, -1, 0, 1, 0}},
    {"face of no area: a segment", 0, 1, 0.5, {.5, 0, 1, 0, 0, 0, 1, 0, 0, .5, 0, 0,
                                               .5, 0, -1, 0, 0, 0, 1, 0, 0, .5, 0, 0}},
    {"face of no area: a point", 0, 1, 0.5, {.5, 0, 1, .5, 0, 0, .5, 0, 0, .5, 0, 0,
                                             .5, 0, -1, .5, 0, 0, .5, 0, 0, .5, 0, 0}},
    {"face shrinks to a point and grows", 0, 1, 0.5,
     {0, 0, 0, 1, 0, 1, 0, 1, 1, -1, -1, 1, 0, 0, 0, -1, 0, -1, 0, -1, -1, 1, 1, -1}},
    {"inverts through the vertex", 0, 1, 0.5,
     {0, 0, 0, -1, -1, 1, 1, -1, 1, 0, 1, 1, 0, 0, 0, -1, -1, -1, 1, -1, -1, 0, 1, -1}},
    {"edges cross", 1, 1, 0.5, {-1, 0, 1, 1, 0, 1, 0, -1, 0, 0, 1, 0,
                                -1, 0, -1, 1, 0, -1, 0, -1, 0, 0, 1, 0}},
    {"parallel edges", 1, 1, 0.25, {-1, 0, 1, 1, 0, 1, -1, 0, 0, 1, 0, 0,
                                    -1, 0, -3, 1, 0, -3, -1, 0, 0, 1, 0, 0}},
    {"parallel edges that overlap in part", 1, 1, 0.25,
     {0, 0, 1, 4, 0, 1, -1, 0, 0, 1, 0, 0, 0, 0, -3, 4, 0, -3, -1, 0, 0, 1, 0, 0}},
    {"parallel edges that miss", 1, 0, 1,
     {1.0000000000000002, 0, 1, 4, 0, 1, -1, 0, 0, 1, 0, 0,
      1.0000000000000002, 0, -3, 4, 0, -3, -1, 0, 0, 1, 0, 0}},
    {"edges on one line meet", 1, 1, 0.5, {-3, 0, 0, -2, 0, 0, 0, 0, 0, 1, 0, 0,
                                           1, 0, 0, 2, 0, 0, 0, 0, 0, 1, 0, 0}},
    {"edges in one plane meet", 1, 1, 0.5, {-2, 0, 0, -1, 0, 0, 0, -1, 0, 0, 1, 0,
                                            0, 0, 0, 1, 0, 0, 0, -1, 0, 0, 1, 0}},
    {"end on end", 1, 1, 0.5, {1, 0, 1, 2, 1, 1, 1, 0, 0, 2, -1, 0,
                               1, 0, -1, 2, 1, -1, 1, 0, 0, 2, -1, 0}},
    {"edges of no length", 1, 1, 0.5, {1, 0, 1, 1, 0, 1, 1, 0, 0, 1, 0, 0,
                                       1, 0, -1, 1, 0, -1, 1, 0, 0, 1, 0, 0}},
    {"one edge of no length", 1, 1, 0.5, {1, 0, 1, 1, 0, 1, 0, 0, 0, 2, 0, 0,
                                          1, 0, -1, 1, 0, -1, 0, 0, 0, 2, 0, 0}},
    {"edge turns through the other", 1, 1, 0.5,
     {-1, 0, -1, 1, 0, 1, 0, -1, 0.5, 0, 1, 0.5, -1, 0, 1, 1, 0, 1, 0, -1, 0.5, 0, 1, 0.5}},
    {"edges share an end", 1, 1, 0, {0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0,
                                     0, 0, 1, 1, 0, 1, 0, 0, 1, 0, 1, 1}},
    {"all points in one", 1, 1, 0, {0}},
};

static void hard_queries(void) {
    static const double scales[] = {1, 1e-9, 1e9, 1e-150, 1e150, 1e-290, 1e307};
    int                 i, j, k;
    for (i = 0; i < (int)(sizeof hard_ones / sizeof *hard_ones); i++)
        for (k = 0; k < 7; k++) {
            const hard *h = hard_ones + i;
            const double s = ldexp(1, (int)floor(log2(scales[k])));
            double       x[24], toi = -1;
            int          hit;
            for (j = 0; j < 24; j++) x[j] = s * h->x[j];
            hit = ccd_call(h->ee, x, 0, &toi);
            if (hit != h->hit || !(toi <= h->toi) || !(toi >= h->toi - 1e-7))
                printf("  %s, scale %g: %d at %.17g\n", h->name, s, hit, toi);
            CHECK(hit == h->hit);
            CHECK(toi <= h->toi && toi >= h->toi - 1e-7);
        }
}

/* Points at the time of contact and velocities are multiples of 2^-8, the time is of 2^-6: all
 * positions are exact and so is the contact. */
static void exact_contacts(void) {
    unsigned long long seed = 3;
    const int          rounds = test_full() ? 200000 : 20000;
    int                k, i, j, missed = 0, late = 0;
    for (k = 0; k < rounds; k++) {
        const int    ee = k & 1, flat = k % 7 == 0, still = k % 5 == 0;
        const double time = (double)(ref_next(&seed) % 65) / 64;
        const double far = k % 3 ? 0 : 4096, scale = ldexp(1, (int)(ref_next(&seed) % 60) - 30);
        double       x[24], w[4], p[4][3], v[4][3], toi = 2;
        for (i = 0; i < 4; i++)
            for (j = 0; j < 3; j++) {
                const int whole = still && i > 0 && j > 0;
                p[i][j] = 4 * floor(ref_uniform(&seed, -16, 16)) / (k % 11 == 0 ? 64 : 1);
                v[i][j] = whole ? 0 : floor(ref_uniform(&seed, -64, 64)) / (k % 13 ? 1 : 256);
                if (flat && j == 2) p[i][j] = v[i][j] = 0;
            }
        w[1] = (double)(ref_next(&seed) % 5) / 4;       /* inside, on sides and on corners */
        w[2] = (double)(ref_next(&seed) % (ee ? 5 : 5 - (unsigned)(4 * w[1]))) / 4;
        for (j = 0; j < 3; j++)
            if (ee) {                       /* moves the second edge onto the first */
                const double d = (1 - w[1]) * p[0][j] + w[1] * p[1][j] - (1 - w[2]) * p[2][j] -
                                 w[2] * p[3][j];
                p[2][j] += d;
                p[3][j] += d;
            } else
                p[0][j] = (1 - w[1] - w[2]) * p[1][j] + w[1] * p[2][j] + w[2] * p[3][j];
        for (i = 0; i < 4; i++)
            for (j = 0; j < 3; j++) {
                x[3 * i + j] = scale * (far + p[i][j] - time * v[i][j]);
                x[12 + 3 * i + j] = scale * (far + p[i][j] + (1 - time) * v[i][j]);
            }
        missed += !ccd_call(ee, x, 0, &toi);
        late += !(toi <= time);
        if (k % 16 < 2) missed += !ccd_call(ee, x, scale * 1e-3, &toi) || !(toi <= time);
    }
    printf("  %d contacts: missed %d, late %d\n", rounds, missed, late);
    CHECK(missed == 0 && late == 0);
}

/* ---- with a separation */

static void closed_forms(void) {
    static const double seps[] = {1e-12, 1e-6, 1e-3, 0.01, 0.3};
    int                 k;
    for (k = 0; k < 5; k++) {
        const double s = seps[k], tol = 3e-6 * s + 1e-13;
        /* a vertex falls 1 with speed 2 on a face, beside it on a side, on a corner */
        double face[24] = {.25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                           .25, .25, -1, 0, 0, 0, 1, 0, 0, 0, 1, 0};
        double edge[24] = {-1, 0, 1, 1, 0, 1, 0, -1, 0, 0, 1, 0,
                           -1, 0, -1, 1, 0, -1, 0, -1, 0, 0, 1, 0};
        double lines[24] = {-1, 0, 1, 1, 0, 1, -2, 0, 0, .5, 0, 0,
                            -1, 0, -1, 1, 0, -1, -2, 0, 0, .5, 0, 0};
        double toi = -1, drop;
        CHECK(cloth_ccd_vf(face, face + 12, s, &toi));
        CHECK(toi <= (1 - s) / 2 && toi >= (1 - s) / 2 - tol);
        CHECK(cloth_ccd_ee(edge, edge + 12, s, &toi));
        CHECK(toi <= (1 - s) / 2 && toi >= (1 - s) / 2 - tol);
        CHECK(cloth_ccd_ee(lines, lines + 12, s, &toi));
        CHECK(toi <= (1 - s) / 2 && toi >= (1 - s) / 2 - tol);
        face[1] = face[13] = -0.6 * s;      /* the side is a cylinder of radius s               */
        drop = 0.8 * s;
        CHECK(cloth_ccd_vf(face, face + 12, s, &toi));
        CHECK(toi <= (1 - drop) / 2 + 1e-15 && toi >= (1 - drop) / 2 - tol);
        face[1] = face[13] = -1.00001 * s - 2e-14;
        CHECK(!cloth_ccd_vf(face, face + 12, s, &toi) && toi == 1);
        face[0] = face[12] = face[1] = face[13] = -0.48 * s;    /* the corner a ball            */
        drop = sqrt(1 - 2 * 0.48 * 0.48) * s;
        CHECK(cloth_ccd_vf(face, face + 12, s, &toi));
        CHECK(toi <= (1 - drop) / 2 + 1e-15 && toi >= (1 - drop) / 2 - tol);
        lines[6] = 1 + 0.6 * s;             /* past the end of the parallel edge                */
        lines[18] = lines[6];
        lines[9] = lines[21] = 3;
        CHECK(cloth_ccd_ee(lines, lines + 12, s, &toi));
        CHECK(toi <= (1 - 0.8 * s) / 2 + 1e-15 && toi >= (1 - 0.8 * s) / 2 - tol);
        face[2] = s;                        /* at the start, also when they part                */
        face[0] = face[1] = face[12] = face[13] = .25;
        face[14] = 1;
        CHECK(cloth_ccd_vf(face, face + 12, s, &toi) && toi == 0);
        face[2] = s * (1 + 1e-5) + 1e-14;
        CHECK(!cloth_ccd_vf(face, face + 12, s, &toi));
    }
}

/* One random motion: what is near at the end of the range of sizes, slivers, slow and fast. */
static void draw(unsigned long long *seed, int ee, double *x, double *sep) {
    const double scale = pow(10, ref_uniform(seed, -9, 9));
    const double move = pow(10, ref_uniform(seed, -3, 0.5));
    const double squash = ref_next(seed) % 3 ? 1 : pow(10, ref_uniform(seed, -6, 0));
    const double far = ref_next(seed) % 3 ? 0 : pow(10, ref_uniform(seed, 0, 4));
    double       R[9], by[3];
    int          i, j;
    ref_rotation(seed, R);
    for (i = 0; i < 12; i++) {
        x[i] = ref_uniform(seed, -1, 1) * (i % 3 == 1 ? squash : 1);
        x[12 + i] = x[i] + move * ref_uniform(seed, -1, 1);
    }
    if (ref_next(seed) % 4 == 0)            /* all the same turn for all points */
        for (i = 0; i < 12; i++) x[12 + i] = x[i] + move * (i % 3 == 2 ? x[i - 1] : 0.3);
    if (ref_next(seed) % 2) {               /* a meeting, nearly                                */
        const double time = ref_uniform(seed, 0.05, 1), u = ref_uniform(seed, 0, 1);
        const double w[4] = {1 - u, u, ee ? ref_uniform(seed, -1, 0) : u / 2 - 0.5, 0};
        for (j = 0; j < 3; j++) {
            double gap = 0;
            for (i = 0; i < 4; i++) {
                const double wi = ee ? (i < 2 ? w[i] : i < 3 ? w[2] : -1 - w[2])
                                     : (i < 1 ? 1 : i < 2 ? w[2] : i < 3 ? -u / 2 : -0.5);
                gap += wi * ((1 - time) * x[3 * i + j] + time * x[12 + 3 * i + j]);
            }
            gap *= (1 + 1e-3 * ref_uniform(seed, -1, 1)) / time;
            x[12 + j] -= gap;
            if (ee) x[15 + j] -= gap;
        }
    }
    for (j = 0; j < 3; j++) by[j] = far * ref_uniform(seed, -1, 1);
    ref_move(R, by, 8, x);
    for (i = 0; i < 24; i++) x[i] *= scale;
    *sep = ref_next(seed) % 4 ? scale * pow(10, ref_uniform(seed, -6, -0.5)) : 0;
}

/* hit when the least sampled distance is within s, none when it is beyond s and what is allowed;
 * free before toi, and near at toi. */
static void against_samples(void) {
    unsigned long long seed = 11;
    const int          rounds = test_full() ? 200000 : test_quick() ? 3000 : 20000;
    int                k, missed = 0, alarms = 0, early = 0, loose = 0, hits = 0;
    double             most = 0;
    if (!test_long_double()) SKIP("long double has the bits of double here");
    for (k = 0; k < rounds; k++) {
        double    x[24], s, toi = -1, size, slack;
        ref_real  at, least, before, there;
        const int ee = k & 1;
        int       hit;
        draw(&seed, k & 1, x, &s);
        size = ccd_size(x);
        hit = ccd_call(ee, x, s, &toi);
        hits += hit;
        slack = 1.01e-6 * s + 3e-14 * size;
        least = ccd_least(ee, x, 1, 100, &at);
        missed += least <= (ref_real)s && (!hit || (ref_real)toi > at);
        if (!hit) continue;
        before = toi > 0 ? ccd_least(ee, x, (ref_real)toi * (1 - 1e-15L), 50, &at) : HUGE_VALL;
        early += before <= (ref_real)s;
        there = ccd_distance(ee, x, (ref_real)toi);
        alarms += fminl(least, there) > (ref_real)(s + slack);
        most = fmax(most, (double)(there - (ref_real)s) / slack);
        loose += there > (ref_real)(s + slack);
    }
    printf("  %d motions, %d hits: missed %d, false alarms %d, within s before toi %d; distance at "
           "toi beyond s: at most %.2g of the allowance\n", rounds, hits, missed, alarms, early,
           most);
    CHECK(missed == 0 && early == 0);
    CHECK(hits > rounds / 10 && hits < rounds - rounds / 10);
    CHECK(alarms <= rounds / 5000 && loose <= rounds / 5000);
}

/* A face whose sides are 1e-80 of the motion: the bound of its normal underflows. */
static void tiny_face(void) {
    double x[24] = {0, 4, 0, 0, 0, 0, 1e-80, 0, 0, 0, 0, 1e-80,
                    0, 0, 0, 0, 0, 0, 1e-80, 0, 0, 0, 0, 1e-80};
    double toi = -1;
    int    i, k;
    for (k = -300; k <= 200; k += 50) {
        double y[24];
        for (i = 0; i < 24; i++) y[i] = ldexp(x[i], k);
        CHECK(cloth_ccd_vf(y, y + 12, ldexp(1, k), &toi));
        CHECK(toi <= 0.75 && toi >= 0.7499);
        CHECK(cloth_ccd_vf(y, y + 12, 0, &toi) && toi <= 1);
    }
}

/* ---- arguments */

static void arguments(void) {
    double    x[24] = {.25, .25, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0,
                       .25, .25, -1, 0, 0, 0, 1, 0, 0, 0, 1, 0};
    double    toi = -1, keep;
    const double odd[3] = {NAN, INFINITY, -INFINITY};
    int       i, k;
    CHECK(cloth_ccd_vf(x, x + 12, 0, NULL) == 1);
    CHECK(cloth_ccd_ee(x, x + 12, 1e-3, NULL) == cloth_ccd_ee(x, x + 12, 1e-3, &toi));
    CHECK(cloth_ccd_vf(x, x + 12, -1, &toi) == 1 && toi > 0.49 && toi <= 0.5);
    CHECK(cloth_ccd_vf(x, x + 12, 100, &toi) == 1 && toi == 0);
    CHECK(cloth_ccd_vf(x, x + 12, 1e308, &toi) == 1 && toi == 0);
    for (k = 0; k < 3; k++) {
        for (i = 0; i < 24; i++) {
            keep = x[i];
            x[i] = odd[k];
            toi = -1;
            CHECK(cloth_ccd_vf(x, x + 12, 0, &toi) == 1 && toi == 0);
            toi = -1;
            CHECK(cloth_ccd_ee(x, x + 12, 1e-3, &toi) == 1 && toi == 0);
            x[i] = keep;
        }
        toi = -1;
        CHECK(cloth_ccd_vf(x, x + 12, odd[k], &toi) == 1 && toi == 0);
    }
    for (i = 0; i < 24; i++) x[i] = i % 2 ? 1.7e308 : -1.7e308;     /* differences overflow */
    CHECK(cloth_ccd_vf(x, x + 12, 0, &toi) == 1 && toi == 0);
    for (i = 0; i < 24; i++)                /* the same, and far apart */
        x[i] = i % 12 < 3 ? 1.7e308 : -1.7e308 + 1e306 * (i % 5);
    CHECK(cloth_ccd_vf(x, x + 12, 1e300, &toi) == 0 && toi == 1);
    for (i = 0; i < 24; i++) x[i] = 4.9e-324 * (i % 5);
    CHECK(cloth_ccd_ee(x, x + 12, 1e-300, &toi) == 1 && toi == 0);
}

/* ---- distances and frames */

static void distances(void) {
    unsigned long long seed = 5;
    const int          rounds = test_quick() ? 20000 : 200000;
    int                k, i, j, bad = 0;
    double             worst = 0;
    for (k = 0; k < rounds; k++) {
        double x[24], w[4], s, d, span = 0, sum = 0, size;
        draw(&seed, k & 1, x, &s);
        if (k % 5 == 0) memcpy(x + 9, x + 6, 3 * sizeof *x);        /* no area, no length */
        if (k % 10 == 0) memcpy(x + 3, x, 3 * sizeof *x);
        if (k % 7 == 0)                     /* parallel */
            for (j = 0; j < 3; j++) x[9 + j] = x[6 + j] + x[3 + j] - x[j];
        if (k % 17 == 0)
            for (j = 0; j < 12; j++) x[j] *= k % 2 ? 1e-180 : 1e180;
        memcpy(x + 12, x, 12 * sizeof *x);
        size = ccd_size(x);
        d = clothi_pair_distance(k & 1, x, w);
        if (size > 1e-100 && size < 1e100) {
            const ref_real exact = ccd_distance(k & 1, x, 0);
            worst = fmax(worst, fabs((double)((ref_real)d - exact)) / size);
        }
        for (i = 0; i < 4; i++) sum += w[i];
        for (j = 0; j < 3; j++) {
            double v = 0;
            for (i = 0; i < 4; i++) v += w[i] * (x[3 * i + j] - x[j]);
            span += v / size * (v / size);
        }
        bad += fabs(sum) > 1e-15 || fabs(sqrt(span) - d / size) > 1e-14;
        for (i = 0; i < 4; i++) {
            const int front = k & 1 ? i < 2 : i < 1;
            bad += front ? w[i] < 0 || w[i] > 1 : w[i] > 1e-15 || w[i] < -1 - 1e-15;
        }
        bad += fabs((k & 1 ? w[0] + w[1] : w[0]) - 1) > 1e-15;
    }
    printf("  worst error of a distance: %.1e of the size\n", worst);
    CHECK(bad == 0);
    CHECK(worst < 1e-10);
}

/* Points of needles, whose angle is down to 1e-7, and just off them. Normal equations, whose
 * determinant is of angle^2, take points on a needle of 1e-5 for points beside it: off by 1e-7. */
static void needles(void) {
    unsigned long long seed = 6;
    double             worst = 0;
    int                k, j;
    for (k = 0; k < 20000; k++) {
        const double thin = pow(10, ref_uniform(&seed, -7, 0)), s = ref_uniform(&seed, 0, 1);
        const double off = pow(10, ref_uniform(&seed, -12, 0)), t = ref_uniform(&seed, 0, 1);
        const double length = ref_uniform(&seed, -2, 2);
        double       x[24], w[4];
        for (j = 0; j < 3; j++) {
            const double e = ref_uniform(&seed, -1, 1);
            const double f = length * e + thin * ref_uniform(&seed, -1, 1);
            const double at = s * e + (k & 1 ? -t : t * (1 - s)) * f;
            x[j] = ref_uniform(&seed, -1, 1);
            x[3 + j] = x[j] + (k & 1 ? e : off * ref_uniform(&seed, -1, 1) - at);
            x[6 + j] = k & 1 ? x[j] + off * ref_uniform(&seed, -1, 1) + at : x[3 + j] + e;
            x[9 + j] = (k & 1 ? x[6 + j] : x[3 + j]) + f;
        }
        memcpy(x + 12, x, 12 * sizeof *x);
        worst = fmax(worst, fabs((double)((ref_real)clothi_pair_distance(k & 1, x, w) -
                                          ccd_distance(k & 1, x, 0))) / ccd_size(x));
    }
    printf("  worst error of the distance of a needle: %.1e of the size\n", worst);
    CHECK(worst < 1e-8);
}

/* Side, unit length, sum of weights; on hits of random motions and of the hard ones. */
static int frame_is_good(int ee, const double *x, double toi, double *w, double *n) {
    const double g = clothi_contact_frame(ee, x, x + 12, toi, w, n);
    double       side = 0, sum = 0, start[24], v[4], d0;
    int          i, j;
    for (i = 0; i < 4; i++) {
        sum += w[i];
        for (j = 0; j < 3; j++) side += w[i] * n[j] * (x[3 * i + j] - x[j]);
    }
    memcpy(start, x, 12 * sizeof *x);
    d0 = clothi_pair_distance(ee, start, v);
    return fabs(sum) < 1e-15 && fabs(clothi_dot3(n, n) - 1) < 1e-14 &&
           fabs(g - side) <= 1e-13 * ccd_size(x) && (g > 0 || d0 <= 1e-12 * ccd_size(x));
}

static void frames(void) {
    unsigned long long seed = 17;
    double             w[4], n[3], toi;
    int                k, bad = 0, hits = 0;
    for (k = 0; k < 50000; k++) {
        double x[24], s;
        draw(&seed, k & 1, x, &s);
        if (!ccd_call(k & 1, x, s, &toi)) continue;
        hits++;
        bad += !frame_is_good(k & 1, x, toi, w, n);
    }
    CHECK(bad == 0 && hits > 5000);
    for (k = 0; k < (int)(sizeof hard_ones / sizeof *hard_ones); k++)
        if (hard_ones[k].hit) {
            CHECK(ccd_call(hard_ones[k].ee, hard_ones[k].x, 0, &toi));
            CHECK(frame_is_good(hard_ones[k].ee, hard_ones[k].x, toi, w, n));
        }
    (void)ccd_call(0, hard_ones[0].x, 0, &toi);
    clothi_contact_frame(0, hard_ones[0].x, hard_ones[0].x + 12, toi, w, n);
    CHECK_NEAR(n[2], 1, 1e-15);
    CHECK_NEAR(w[1], -0.5, 1e-12);
    CHECK_NEAR(w[2], -0.25, 1e-12);
    (void)ccd_call(0, hard_ones[6].x, 0, &toi);         /* in the plane: along the motion */
    CHECK(!strcmp(hard_ones[6].name, "in the plane, into a side"));
    clothi_contact_frame(0, hard_ones[6].x, hard_ones[6].x + 12, toi, w, n);
    CHECK_NEAR(n[0], -1, 1e-6);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(public_queries);
    RUN(permuted);
    RUN(scaled);
    RUN(translated);
    RUN(hard_queries);
    RUN(exact_contacts);
    RUN(closed_forms);
    RUN(against_samples);
    RUN(tiny_face);
    RUN(arguments);
    RUN(distances);
    RUN(needles);
    RUN(frames);
    return TEST_END();
}
