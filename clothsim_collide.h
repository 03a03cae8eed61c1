/* clothsim_collide.h - what cloth may not pass through.                       version 0.1.0
 * SPDX-License-Identifier: MIT
 *
 * Collisions for clothsim.h: continuous detection, impact zones solved by a quadratic program,
 * a proximity potential and friction inside the implicit step. C99, libc and libm only.
 *
 * In ONE .c file:        #define CLOTHSIM_IMPLEMENTATION
 *                        #include "clothsim_collide.h"
 * everywhere else:       #include "clothsim_collide.h"         (it includes clothsim.h)
 *
 * CONTENTS
 *   the interface
 *     [2.1] CONTINUOUS DETECTION             [2.2] QUADRATIC PROGRAM
 *     [2.3] INTERSECTIONS                    [2.4] DISTANCE GRID
 *     [2.5] CONTACT
 *   the implementation, bottom-up
 *     [3.1] EXACT SIGNS                      [3.2] DISTANCES
 *     [4.1] CONTINUOUS DETECTION
 *     [5.1] HIERARCHY                        [5.2] TRIANGLES THAT INTERSECT
 *     [6.1] QUADRATIC PROGRAM
 *     [7.1] DISTANCE GRID                    [7.2] OBSTACLES THAT PENETRATE THEMSELVES
 *     [8.1] SCENE                            [8.2] PROXIMITY AND FRICTION
 *     [8.3] IMPACT ZONES                     [8.4] THE CONTACT IN THE STEP
 *     [8.5] QUERIES                          [9.1] CHANGES
 */

#ifndef CLOTHSIM_COLLIDE_H
#define CLOTHSIM_COLLIDE_H

#include "clothsim.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [2.1] CONTINUOUS DETECTION ============================================================ */

/* ===== [2.2] QUADRATIC PROGRAM =============================================================== */

/* min 1/2 sum_i (x_i - x0_i)^2 / minv_i   s.t.   G x <= h,   G sparse by rows              [6.1] */
typedef struct cloth_qp {
    int n, m;                   /* unknowns >= 1, constraints >= 0                             */
    const double *minv;         /* [n]      1/kg, >= 0; 0: x_i stays at x0_i                   */
    const double *x0;           /* [n]      m                                                  */
    const int    *row;          /* [m+1]    start of each row in col and val; row[0] = 0       */
    const int    *col;          /* [row[m]] a column named twice in a row is summed            */
    const double *val;          /* [row[m]]                                                    */
    const double *h;            /* [m]      m                                                  */
} cloth_qp;

typedef enum cloth_qp_outcome {
    CLOTH_QP_NONE = 0,          /* the call failed: see its status                             */
    CLOTH_QP_SOLVED = 1,
    CLOTH_QP_INFEASIBLE = 2,    /* no x satisfies the rows: lambda proves it                   */
    CLOTH_QP_MAX_ITERATIONS = 3 /* neither; x and lambda are the last iterate                  */
} cloth_qp_outcome;

/* Memory that solves share: opaque. One solve at a time. */
typedef struct cloth_qp_work cloth_qp_work;

#define CLOTH_DEFAULT_QP_TOLERANCE 1e-9

typedef struct cloth_qp_options {
    uint32_t       cookie;      /* set by cloth_qp_options_default()                           */
    cloth_hooks    hooks;       /* allocator (without work), log, cancel: asked per iteration  */
    double         tolerance;   /* relative KKT residual, > 0; default 1e-9                    */
    int            max_iterations;  /* active sets tried, >= 0; default 0: 100 + 10 m          */
    const double  *guess;       /* [m] multipliers of a similar problem, borrowed; default     */
                                /* NULL. Rows with guess > 0 are tried first                   */
    cloth_qp_work *work;        /* borrowed; default NULL: memory is taken and given back      */
} cloth_qp_options;

typedef struct cloth_qp_report {
    cloth_qp_outcome outcome;
    int    iterations;          /* active sets tried                                           */
    int    factorizations;      /* of the matrix of an active set, from its first row          */
    int    refactorizations;    /* of a part of it, when a row left                            */
    int    active;              /* rows with lambda > 0                                        */
    int    dropped;             /* rows without a free unknown, and copies of other rows       */
    int    precise;             /* 1: finished in twice the digits, the rows being almost      */
                                /* dependent; 0: plain doubles were enough                     */
    double primal;              /* max (g x - h)+ / s, s = |h| + sum |g| r; r_j the largest of */
                                /* |x_j|, |x0_j| and, up to max |x|, minv_j sum_i |G_ij| l_i   */
    double dual;                /* max |x - x0 + minv G'lambda| / max(|x|, |x0|, minv |G'||l|) */
    double complementarity;     /* max |h - g x| / s over rows with lambda > 0                 */
    double residual;            /* the largest of the three; <= tolerance when solved          */
    double objective;           /* kg m^2                                                      */
    double certificate;         /* lambda.(h - G_fixed x0_fixed) m; < 0 when infeasible else 0 */
} cloth_qp_report;

CLOTH_API cloth_qp_options cloth_qp_options_default(void);

/* Solves the QP.                                                                           [6.1]
 * in   qp       as above; every number finite
 * in   opt      NULL: defaults
 * out  x        [n] m, may be NULL. Infeasible: x0
 * out  lambda   [m] >= 0, kg m per unit of the row; may be NULL.  x = x0 - minv o (G' lambda).
 *               Infeasible: a certificate: max 1, |G_free' lambda| <= 1e-10 max|G| and
 *               lambda.(h - G_fixed x0_fixed) < 0 by more than rounding, so that a positive sum
 *               of the rows reads 0 <= something negative
 * out  rep      may be NULL
 * returns CLOTH_OK, whatever the outcome; CLOTH_ERR_ARGUMENT, _NONFINITE: a sentence names the
 *   field and its value; _UNINIT: options without cookie; _MEMORY; _CAPACITY: the matrix of the
 *   rows would have more than 2^31 entries; _CANCELLED. x and lambda are as before then.
 * x is unique. lambda is unique only where the active rows are independent.
 * The same input gives the same bits. A guess can change them only where the optimum has several
 * active sets (dependent rows, multipliers that are zero at the optimum) or the outcome is not
 * SOLVED; work never does.
 * contract: alloc none with work of a similar solve behind it, else O(size) | cost one row: closed
 *   form; else about 5 factorizations of the active rows ordered to a small profile: O(m p^2), p
 *   the mean profile | threads: distinct work */
CLOTH_API cloth_status cloth_qp_solve(const cloth_qp *qp, const cloth_qp_options *opt, double *x,
                                      double *lambda, cloth_qp_report *rep);

/* out  *out     owned: cloth_qp_work_destroy, NULL allowed; NULL on failure. hooks: copied; NULL:
 *               malloc.  Keeps the memory of the largest solve.  returns CLOTH_OK, _ARGUMENT,
 *               _MEMORY */
CLOTH_API cloth_status cloth_qp_work_create(const cloth_hooks *hooks, cloth_qp_work **out);
CLOTH_API void   cloth_qp_work_destroy(cloth_qp_work *work);
CLOTH_API size_t cloth_qp_work_bytes(const cloth_qp_work *work);

/* ===== [2.3] INTERSECTIONS =================================================================== */

/* ===== [2.4] DISTANCE GRID =================================================================== */

/* ===== [2.5] CONTACT ========================================================================= */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_COLLIDE_H */

/* =============================================================================================
 *                                       IMPLEMENTATION
 * ============================================================================================= */

#if defined(CLOTHSIM_IMPLEMENTATION) && !defined(CLOTHSIM_COLLIDE_IMPLEMENTED)
#define CLOTHSIM_COLLIDE_IMPLEMENTED

#ifdef __cplusplus
extern "C" {
#endif

/* ===== [3.1] EXACT SIGNS ===================================================================== */

/* ===== [3.2] DISTANCES ======================================================================= */

/* ===== [4.1] CONTINUOUS DETECTION ============================================================ */

/* ===== [5.1] HIERARCHY ======================================================================= */

/* ===== [5.2] TRIANGLES THAT INTERSECT ======================================================== */

/* ===== [6.1] QUADRATIC PROGRAM ===============================================================
 *
 *        \ row 1    x0              primal  min 1/2 sum (x-x0)^2/minv   s.t.  G x <= h
 *         \        /                dual    min 1/2 l'A l - b'l         s.t.  l >= 0
 *  allowed \      /  - minv G'l             A = G minv G',  b = G x0 - h
 *           \    v                  optimum x = x0 - minv G'l,  w = h - G x >= 0,  l >= 0,
 *            o--x------- row 2              l_i w_i = 0 in every row
 *
 * A projection in the metric of the masses: x0 goes to the nearest allowed point, pulled by the
 * multipliers l of the rows that hold it. Strictly convex in x: x is unique; l is where the active
 * rows are independent. A is semidefinite, m x m, sparse: rows couple that share a free unknown.
 *
 *   scale     row i over a power of two, so that 1/4 <= a_ii < 1: exact. Unknowns with minv = 0 go
 *             into h. A row without a free unknown is dropped, or proves infeasibility by itself.
 *             Of rows equal but for rounding the tightest stays.
 *   order     reverse Cuthill-McKee [CM69]: L of any set of rows has a small profile, and its
 *             inner loop is a dot product of two stretches of memory
 *   1 guess   the set F = rows violated at x0 (or with guess > 0)
 *   2 block   solve A_FF l_F = b_F by L L', refined through the slacks w; exchange all rows of the
 *     pivots  wrong sign (l_i < 0 leaves F, w_i < 0 enters) [JP94]; of rows within 60 degrees that
 *             are violated only the worst enters. Again while that leaves fewer wrong rows; about
 *             5 sets for 1000 rows. None wrong: done.
 *   3 finish  dual active set [GI83] from what F is worth (independent rows, l > 0), in arithmetic
 *             of 32 digits [D71]: the most violated row p enters along the direction d in which
 *             all of F stay equations, l += t d, d = (-A_FF^-1 A_Fp, 1): up to where p holds, or
 *             where some l_j = 0 and row j leaves F. Neither: d is a Farkas certificate.
 *   settle    the set found, once more in the common order: the bits are those of the set
 *
 * Why it ends: 2 stops after a few tries without a smaller number of wrong rows. In 3 each entry
 * raises the dual objective strictly, so no set comes twice, and between two entries rows only
 * leave. Why 3 has twice the digits: rows that stand off each other by the angle e put e^2 into A,
 * so that doubles see 1e-8, where contacts seen twice differ by less; the apex of such a wedge lies
 * 1/e times the rows' misfit away. Step 2 is believed only where every row that looks active stands
 * more than 1e-5 off the span of F (the square, DEPENDENT, is 1e-10): a twentieth of the time.
 * Rows nearer than 1e-13 (COPY) are one row; a ray shorter than that is a contradiction.
 *
 * Farkas: y >= 0 with G_free'y = 0 and y.(h - G_fixed x0) < 0 rules out any x: y.(G x) is both
 * y.(G_fixed x0) and at most y.h. It is checked on the rows as given before it is returned.
 *
 * Tried and lost: pivots of single rows by least index when block pivots stall (30 to 300 more
 * factors; step 3 needs 5 to 50 rows); all violated rows into F (four near copies of each contact:
 * block pivots stall from 50 rows on, 3000 rows take 450 ms instead of 3).
 *
 * [GI83] Goldfarb, Idnani, Math. Programming 27 (1983) 1-33. doi:10.1007/BF02591962
 * [JP94] Judice, Pires, Computers Ops Res. 21 (1994) 587-596. doi:10.1016/0305-0548(94)90106-6
 * [CM69] Cuthill, McKee, Proc. 24th ACM Conf. (1969) 157-172. doi:10.1145/800195.805928
 * [D71]  Dekker, Numer. Math. 18 (1971) 224-242. doi:10.1007/BF01397083
 * code   lambda l, w slack, act the set F, at a row's place in L, list its inverse; ..2: 32 digits
 * checked  tests/test_qp.c (closed forms, enumeration, public problems), tests/fuzz_qp.c;
 *          time: tests/bench/bench_qp.c
 */

#define CLOTHI_QP_COOKIE     0x0c107117u
#define CLOTHI_QP_ROUNDING   4.5e-16        /* two roundings                                   */
#define CLOTHI_QP_SMALL      1e-14          /* slack or multiplier, relative: as good as 0     */
#define CLOTHI_QP_DEPENDENT  1e-10          /* square of a row's distance from other rows      */
#define CLOTHI_QP_DEPENDENT2 1e-26          /* the same with twice the digits                  */
#define CLOTHI_QP_SMALL2     1e-19          /* slack with twice the digits: as good as 0       */
#define CLOTHI_QP_DRIFT2     1e-28          /* rounding of a slack, to the largest multiplier  */
#define CLOTHI_QP_START2     1e-18          /* rows nearer to others do not start the set      */
#define CLOTHI_QP_COPY       1e-13          /* distance of two rows that are one               */
#define CLOTHI_QP_CANCELLED  1e-24          /* square of the length of a row that is none      */
#define CLOTHI_QP_TINY       1e-290         /* keeps 0/0 away                                  */
#define CLOTHI_QP_PATIENCE   3              /* tries without fewer wrong rows                  */
#define CLOTHI_QP_PARALLEL   0.25           /* cosine squared: rows that stand for each other  */

/* ----- arithmetic with twice the digits ---------------------------------------------------- */

typedef struct clothi_qp_two {              /* the number hi + lo, |lo| <= ulp(hi) / 2         */
    double hi, lo;
} clothi_qp_two;

static inline clothi_qp_two clothi_qp_sum(double a, double b) {
    clothi_qp_two r;
    double        t;
    r.hi = a + b;
    t = r.hi - a;
    r.lo = (a - (r.hi - t)) + (b - t);
    return r;
}

/* a b exactly. Both ways give the same bits, and so does a compiler that contracts: every partial
 * product is exact. */
static inline clothi_qp_two clothi_qp_product(double a, double b) {
    clothi_qp_two r;
    r.hi = a * b;
#if defined(__FMA__)
    r.lo = fma(a, b, -r.hi);
#else
    {
        const double p = 134217729.0 * a, q = 134217729.0 * b;
        const double a1 = p - (p - a), b1 = q - (q - b), a2 = a - a1, b2 = b - b1;
        r.lo = ((a1 * b1 - r.hi) + a1 * b2 + a2 * b1) + a2 * b2;
    }
#endif
    return r;
}

static inline clothi_qp_two clothi_qp_make(double hi, double lo) {
    clothi_qp_two r;
    r.hi = hi + lo;
    r.lo = lo - (r.hi - hi);
    return r;
}

static inline clothi_qp_two clothi_qp_add(clothi_qp_two a, clothi_qp_two b) {
    const clothi_qp_two s = clothi_qp_sum(a.hi, b.hi), t = clothi_qp_sum(a.lo, b.lo);
    const clothi_qp_two u = clothi_qp_make(s.hi, s.lo + t.hi);
    return clothi_qp_make(u.hi, u.lo + t.lo);
}

static inline clothi_qp_two clothi_qp_mul(clothi_qp_two a, clothi_qp_two b) {
    const clothi_qp_two p = clothi_qp_product(a.hi, b.hi);
    return clothi_qp_make(p.hi, p.lo + (a.hi * b.lo + a.lo * b.hi));
}

static inline clothi_qp_two clothi_qp_neg(clothi_qp_two a) {
    a.hi = -a.hi;
    a.lo = -a.lo;
    return a;
}

static inline clothi_qp_two clothi_qp_div(clothi_qp_two a, clothi_qp_two b) {
    clothi_qp_two q, one, two;
    q.hi = a.hi / b.hi;
    q.lo = 0;
    one = clothi_qp_add(a, clothi_qp_neg(clothi_qp_mul(q, b)));
    two = clothi_qp_make(q.hi, one.hi / b.hi);
    q = clothi_qp_add(one, clothi_qp_neg(clothi_qp_mul(clothi_qp_make(one.hi / b.hi, 0), b)));
    return clothi_qp_make(two.hi, two.lo + q.hi / b.hi);
}

static inline clothi_qp_two clothi_qp_root(clothi_qp_two a) {
    const double        s = sqrt(a.hi);
    const clothi_qp_two r = clothi_qp_add(a, clothi_qp_neg(clothi_qp_product(s, s)));
    return clothi_qp_make(s, 0.5 * r.hi / s);
}

/* s + a b */
static inline clothi_qp_two clothi_qp_axpy(clothi_qp_two s, clothi_qp_two a, double b) {
    const clothi_qp_two p = clothi_qp_product(a.hi, b), t = clothi_qp_sum(s.hi, p.hi);
    return clothi_qp_make(t.hi, t.lo + (s.lo + (p.lo + a.lo * b)));
}

/* s - a.b */
static clothi_qp_two clothi_qp_minus_dot2(clothi_qp_two s, const clothi_qp_two *a,
                                          const clothi_qp_two *b, int n) {
    double hi = s.hi, lo = s.lo;
    int    i;
    for (i = 0; i < n; i++) {
        const clothi_qp_two p = clothi_qp_product(a[i].hi, b[i].hi);
        const clothi_qp_two t = clothi_qp_sum(hi, -p.hi);
        hi = t.hi;
        lo += t.lo - (p.lo + (a[i].hi * b[i].lo + a[i].lo * b[i].hi));
    }
    return clothi_qp_make(hi, lo);
}

static double clothi_qp_minus_dot(double s, const double *CLOTHI_RESTRICT a,
                                  const double *CLOTHI_RESTRICT b, int n) {
    double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
    int    i;
    for (i = 0; i + 4 <= n; i += 4) {
        s0 += a[i] * b[i];
        s1 += a[i + 1] * b[i + 1];
        s2 += a[i + 2] * b[i + 2];
        s3 += a[i + 3] * b[i + 3];
    }
    for (; i < n; i++) s0 += a[i] * b[i];
    return s - ((s0 + s1) + (s2 + s3));
}

/* ----- memory -------------------------------------------------------------------------------- */

enum {
    CLOTHI_QP_INTS, CLOTHI_QP_REALS, CLOTHI_QP_COLUMNS, CLOTHI_QP_SLOTS, CLOTHI_QP_A,
    CLOTHI_QP_A2, CLOTHI_QP_L, CLOTHI_QP_L2, CLOTHI_QP_TWOS, CLOTHI_QP_BUFFERS
};

struct cloth_qp_work {
    cloth_hooks hooks;
    void       *data[CLOTHI_QP_BUFFERS];
    size_t      size[CLOTHI_QP_BUFFERS];    /* bytes                                           */
};

CLOTH_API cloth_qp_options cloth_qp_options_default(void) {
    cloth_qp_options o;
    memset(&o, 0, sizeof o);
    o.cookie = CLOTHI_QP_COOKIE;
    o.tolerance = CLOTH_DEFAULT_QP_TOLERANCE;
    return o;
}

CLOTH_API cloth_status cloth_qp_work_create(const cloth_hooks *hooks, cloth_qp_work **out) {
    if (!out) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "out = NULL: pass an address");
    *out = (cloth_qp_work *)clothi_alloc(hooks, 1, sizeof **out);
    if (!*out) return clothi_fail(hooks, CLOTH_ERR_MEMORY, "no memory for the work of a QP");
    if (hooks) (*out)->hooks = *hooks;
    return CLOTH_OK;
}

static void clothi_qp_work_clear(cloth_qp_work *work) {
    int k;
    for (k = 0; k < CLOTHI_QP_BUFFERS; k++) clothi_free(&work->hooks, work->data[k]);
}

CLOTH_API void cloth_qp_work_destroy(cloth_qp_work *work) {
    cloth_hooks hooks;
    if (!work) return;
    clothi_qp_work_clear(work);
    hooks = work->hooks;
    clothi_free(&hooks, work);
}

CLOTH_API size_t cloth_qp_work_bytes(const cloth_qp_work *work) {
    size_t bytes = clothi_block_size(work);
    int    k;
    for (k = 0; work && k < CLOTHI_QP_BUFFERS; k++) bytes += clothi_block_size(work->data[k]);
    return bytes;
}

/* A buffer of at least count * size bytes, the first `keep` of them as they were; NULL: no memory,
 * the old one stays. Grown by a quarter more than asked, so that similar solves fit. */
static void *clothi_qp_take(cloth_qp_work *work, int which, size_t count, size_t size,
                            size_t keep) {
    size_t bytes;
    void  *data;
    if (count > (size_t)-1 / 2 / size) return NULL;
    bytes = count * size;
    if (work->data[which] && bytes <= work->size[which]) return work->data[which];
    bytes += bytes / 4;
    data = clothi_alloc(&work->hooks, bytes, 1);
    if (!data) return NULL;
    if (keep) memcpy(data, work->data[which], keep);
    clothi_free(&work->hooks, work->data[which]);
    work->data[which] = data;
    work->size[which] = bytes;
    return data;
}

/* ----- the problem, scaled ------------------------------------------------------------------- */

/* Row i is divided by 2^exponent[i], so that a_ii lies in [1/4, 1): nothing is rounded. Everything
 * below speaks of the scaled rows and of their multipliers. */
typedef struct clothi_qp {
    const cloth_qp    *q;
    const cloth_hooks *hooks;               /* log and cancel                                  */
    cloth_qp_work     *work;
    int      m, n, k;                       /* rows, unknowns, rows of the factor              */
    int      dropped, iterations, most, factorizations, refactorizations;
    int     *keep;          /* [m] 1: a row with a free unknown, no copy of another            */
    int     *act;           /* [m] 1: in the set tried                                         */
    int     *at;            /* [m] place in the factor; -1: not in it; -2: it depends on others */
    int     *order;         /* [m] rows by place in the order of small profile                 */
    int     *list;          /* [m] rows of the factor                                          */
    int     *first;         /* [m] first column of each row of the factor                      */
    int     *mark;          /* [m]                                                             */
    int     *exponent;      /* [m]                                                             */
    int     *cstart;        /* [n+1] entries by column                                         */
    int     *crow, *centry; /* their rows, and their places in g                               */
    int     *astart;        /* [m+1] A = G minv G' by rows, both triangles                     */
    int     *acol;
    double  *aval, *adiag;
    size_t  *lstart;        /* [m+1] factor L: row i from column first[i] to i                 */
    double  *L;
    double  *g, *h;         /* scaled values, 0 where minv is 0; h - G_fixed x0_fixed          */
    double  *b;             /* [m] G x0 - h                                                    */
    double  *lambda, *w;    /* [m] multipliers, slack h - G x                                  */
    double  *size;          /* [m] |h| + sum |g| r, as in the report: the measure of rounding */
    double  *rhs;           /* [m]                                                             */
    double  *x, *u, *v;     /* [n]                                                             */
    clothi_qp_two *a2, *L2, *h2, *b2, *lambda2, *w2, *rhs2, *ray2, *x2, *u2;
} clothi_qp;

/* Slices of the blocks whose size is known beforehand. */
static int clothi_qp_layout(clothi_qp *s) {
    const size_t m = (size_t)s->m, n = (size_t)s->n, nz = (size_t)s->q->row[s->m];
    int    *i = (int *)clothi_qp_take(s->work, CLOTHI_QP_INTS, 9 * m + n + 2, sizeof(int), 0);
    double *d = (double *)clothi_qp_take(s->work, CLOTHI_QP_REALS, nz + 7 * m + 3 * n,
                                         sizeof(double), 0);
    int    *c = (int *)clothi_qp_take(s->work, CLOTHI_QP_COLUMNS, 2 * nz, sizeof(int), 0);
    s->lstart = (size_t *)clothi_qp_take(s->work, CLOTHI_QP_SLOTS, m + 1, sizeof(size_t), 0);
    if (!i || !d || !c || !s->lstart) return 0;
    s->keep = i, s->act = i + m, s->at = i + 2 * m, s->order = i + 3 * m, s->list = i + 4 * m;
    s->first = i + 5 * m, s->mark = i + 6 * m, s->exponent = i + 7 * m;
    s->astart = i + 8 * m, s->cstart = i + 9 * m + 1;
    s->crow = c, s->centry = c + nz;
    s->g = d, d += nz;
    s->h = d, s->b = d + m, s->lambda = d + 2 * m, s->w = d + 3 * m, s->size = d + 4 * m;
    s->rhs = d + 5 * m, s->adiag = d + 6 * m, s->x = d + 7 * m, s->u = s->x + n;
    s->v = s->u + n;
    return 1;
}

/* The exponent e of the row's length: sum minv g^2 = r 4^e, 1/4 <= r < 1; INT_MIN without one. */
static int clothi_qp_exponent(const cloth_qp *q, int i) {
    double sum = 0, big = 0;
    int    e, p;
    for (p = q->row[i]; p < q->row[i + 1]; p++) {
        const double a = q->val[p];
        sum += a * a * q->minv[q->col[p]];
    }
    if (sum > 1e-200 && sum < 1e200) {
        frexp(sum, &e);
        return (e + (e & 1)) / 2;
    }
    /* the square may be beyond the range of doubles, the length is not */
    for (p = q->row[i]; p < q->row[i + 1]; p++)
        big = clothi_max(big, fabs(q->val[p]) * sqrt(q->minv[q->col[p]]));
    if (!(big > 0) || !clothi_finite(big)) return big > 0 ? 0x7fffffff : -0x7fffffff;
    for (p = q->row[i], sum = 0; p < q->row[i + 1]; p++) {
        const double a = q->val[p] * sqrt(q->minv[q->col[p]]) / big;
        sum += a * a;
    }
    frexp(big * sqrt(sum), &e);
    return e;
}

/* Scales row i. 0: fine; 1: no free unknown and satisfied; 2: no free unknown and violated;
 * 3: its length is out of range. */
static int clothi_qp_scale_row(clothi_qp *s, int i) {
    const cloth_qp *q = s->q;
    const int       e = clothi_qp_exponent(q, i);
    const int       begin = q->row[i], end = q->row[i + 1];
    double          unit, h, size, free_x = 0;
    int             p;
    s->keep[i] = e > -0x7fffffff;
    s->exponent[i] = s->keep[i] ? e : 0;
    if (e > 1000 || (s->keep[i] && e < -1000)) return 3;
    unit = ldexp(1.0, -s->exponent[i]);
    h = q->h[i] * unit;
    size = fabs(h);
    for (p = begin; p < end; p++) {
        const int    c = q->col[p];
        const double a = q->val[p] * unit, t = a * q->x0[c];
        const int    fixed = !(q->minv[c] > 0);
        s->g[p] = fixed ? 0 : a;
        if (fixed) h -= t;
        else free_x += t;
        size += fabs(t);
    }
    s->h[i] = h;
    s->b[i] = free_x - h;
    s->size[i] = size;
    if (s->keep[i]) return clothi_finite(size) ? 0 : 3;
    return h < -CLOTHI_QP_SMALL * size ? 2 : 1;
}

/* Entries by column: free ones of the rows that are kept. */
static void clothi_qp_columns(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p, *start = s->cstart;
    memset(start, 0, ((size_t)s->n + 1) * sizeof *start);
    for (p = 0; p < q->row[s->m]; p++) start[q->col[p] + 1] += s->g[p] < 0 || s->g[p] > 0;
    for (i = 0; i < s->n; i++) start[i + 1] += start[i];
    for (i = 0; i < s->m; i++)
        for (p = q->row[i]; p < q->row[i + 1]; p++)
            if (s->g[p] < 0 || s->g[p] > 0) {
                const int to = start[q->col[p]]++;
                s->crow[to] = i;
                s->centry[to] = p;
            }
    memmove(start + 1, start, (size_t)s->n * sizeof *start);
    start[0] = 0;
}

/* A = G minv G'. */
static cloth_status clothi_qp_matrix(clothi_qp *s) {
    const cloth_qp *q = s->q;
    double          most = 0;
    int             i, p, f, nz = 0;
    for (i = 0; i < s->n; i++) {
        const double len = s->cstart[i + 1] - s->cstart[i];
        most += len * len;
    }
    most = clothi_min(most, (double)s->m * s->m);
    if (most > 2147483647.0)
        return clothi_fail(s->hooks, CLOTH_ERR_CAPACITY, "qp.m = %i: its rows share so many "
                           "unknowns that %g pairs of rows couple", s->m, most);
    s->aval = (double *)clothi_qp_take(s->work, CLOTHI_QP_A, (size_t)most + 1,
                                       sizeof(double) + sizeof(int), 0);
    if (!s->aval) return clothi_fail(s->hooks, CLOTH_ERR_MEMORY, "no memory for qp.m = %i", s->m);
    s->acol = (int *)(void *)(s->aval + (size_t)most);
    for (i = 0; i < s->m; i++) s->mark[i] = -1;
    for (i = 0; i < s->m; i++) {
        const int begin = s->astart[i] = nz;
        s->adiag[i] = 0;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int    c = q->col[p];
            const double t = s->g[p] * q->minv[c];
            if (!(t < 0 || t > 0)) continue;
            for (f = s->cstart[c]; f < s->cstart[c + 1]; f++) {
                const int j = s->crow[f];
                if (s->mark[j] < begin) {
                    s->mark[j] = nz;
                    s->acol[nz] = j;
                    s->aval[nz++] = 0;
                }
                s->aval[s->mark[j]] += t * s->g[s->centry[f]];
            }
        }
        if (nz > begin) s->adiag[i] = s->aval[s->mark[i]];
    }
    s->astart[s->m] = nz;
    return CLOTH_OK;
}

/* Of rows that are positive multiples of each other but for rounding, the tightest stays. */
static void clothi_qp_drop_copies(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p, e;
    memset(s->u, 0, (size_t)s->n * sizeof *s->u);
    for (i = 0; i < s->m; i++)
        for (e = s->astart[i]; e < s->astart[i + 1] && s->keep[i]; e++) {
            const int    j = s->acol[e];
            const double a = s->aval[e], t = a / s->adiag[j];
            double       far = 0;
            if (j >= i || !s->keep[j] || !(a > 0)) continue;
            if (a * a < (1 - 1e-6) * s->adiag[i] * s->adiag[j]) continue;
            for (p = q->row[i]; p < q->row[i + 1]; p++) s->u[q->col[p]] += s->g[p];
            for (p = q->row[j]; p < q->row[j + 1]; p++) s->u[q->col[p]] -= t * s->g[p];
            for (p = q->row[i]; p < q->row[i + 1]; p++) {
                far += s->u[q->col[p]] * s->u[q->col[p]] * q->minv[q->col[p]];
                s->u[q->col[p]] = 0;
            }
            for (p = q->row[j]; p < q->row[j + 1]; p++) {
                far += s->u[q->col[p]] * s->u[q->col[p]] * q->minv[q->col[p]];
                s->u[q->col[p]] = 0;
            }
            if (far > CLOTHI_QP_COPY * CLOTHI_QP_COPY * s->adiag[i]) continue;
            s->keep[s->b[i] > t * s->b[j] ? j : i] = 0;
            s->dropped++;
        }
}

/* ----- order --------------------------------------------------------------------------------- */

/* Breadth first from `root` over rows without a place, neighbours by rising degree; returns the
 * row visited last. visited: mark == stamp. */
static int clothi_qp_breadth(clothi_qp *s, int root, int begin, int stamp, int *end) {
    int head = begin, tail = begin, i, e;
    s->order[tail++] = root;
    s->mark[root] = stamp;
    while (head < tail) {
        const int r = s->order[head++], from = tail;
        for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
            const int j = s->acol[e], degree = s->astart[j + 1] - s->astart[j];
            if (s->mark[j] == stamp || !s->keep[j]) continue;
            s->mark[j] = stamp;
            for (i = tail++; i > from; i--) {
                const int o = s->order[i - 1];
                if (s->astart[o + 1] - s->astart[o] <= degree) break;
                s->order[i] = o;
            }
            s->order[i] = j;
        }
    }
    *end = tail;
    return s->order[tail - 1];
}

/* Reverse Cuthill-McKee [CM69] from a row at an end of each component: small profile. */
static void clothi_qp_order(clothi_qp *s) {
    int i, begin = 0, end = 0, stamp = -2, pass;
    for (i = 0; i < s->m; i++) s->mark[i] = -1;
    for (i = 0; i < s->m; i++) {
        int root = i;
        if (s->mark[i] != -1 || !s->keep[i]) continue;
        for (pass = 0; pass < 3; pass++) root = clothi_qp_breadth(s, root, begin, stamp--, &end);
        begin = end;
    }
    for (i = 0; i < end / 2; i++) {
        const int t = s->order[i];
        s->order[i] = s->order[end - 1 - i];
        s->order[end - 1 - i] = t;
    }
    for (i = 0; i < s->m; i++)
        if (!s->keep[i]) s->order[end++] = i;
}

/* ----- factor in doubles --------------------------------------------------------------------- */

/* Row s->k of the factor from row r; *first its first column. Returns the square of the pivot. */
static double clothi_qp_factor_row(clothi_qp *s, int r, double *row, int *first) {
    double pivot = s->adiag[r];
    int    e, j, k = s->k, low = k;
    for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
        const int at = s->at[s->acol[e]];
        if (at >= 0 && at < low) low = at;
    }
    memset(row, 0, (size_t)(k - low) * sizeof *row);
    for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
        const int at = s->at[s->acol[e]];
        if (at >= 0) row[at - low] = s->aval[e];
    }
    for (j = low; j < k; j++) {
        const double *other = s->L + s->lstart[j];
        const int     f = s->first[j], from = f > low ? f : low;
        row[j - low] = clothi_qp_minus_dot(row[j - low], row + (from - low), other + (from - f),
                                           j - from) / other[j - f];
        pivot -= row[j - low] * row[j - low];
    }
    *first = low;
    return pivot;
}

/* Factors the rows with act, in order; those that depend on rows before them get at = -2.
 * 0: no memory. */
static int clothi_qp_factor(clothi_qp *s) {
    size_t need = 1;
    int    p, i, e, k = 0;
    for (i = 0; i < s->m; i++) s->at[i] = -1;
    for (p = 0; p < s->m; p++) {            /* the profile, as if no row were left out */
        int low = k;
        i = s->order[p];
        if (!s->act[i]) continue;
        for (e = s->astart[i]; e < s->astart[i + 1]; e++) {
            const int at = s->at[s->acol[e]];
            if (at >= 0 && at < low) low = at;
        }
        s->at[i] = k++;
        need += (size_t)(k - low);
    }
    s->L = (double *)clothi_qp_take(s->work, CLOTHI_QP_L, need, sizeof(double), 0);
    if (!s->L) return 0;
    for (i = 0; i < s->m; i++) s->at[i] = -1;
    s->k = 0;
    s->lstart[0] = 0;
    s->factorizations++;
    for (p = 0; p < s->m; p++) {
        double *row = s->L + s->lstart[s->k], pivot;
        i = s->order[p];
        if (!s->act[i]) continue;
        pivot = clothi_qp_factor_row(s, i, row, s->first + s->k);
        if (!(pivot > CLOTHI_QP_DEPENDENT * s->adiag[i])) {
            s->at[i] = -2;
            continue;
        }
        row[s->k - s->first[s->k]] = sqrt(pivot);
        s->list[s->k] = i;
        s->at[i] = s->k;
        s->lstart[s->k + 1] = s->lstart[s->k] + (size_t)(s->k - s->first[s->k] + 1);
        s->k++;
    }
    return 1;
}

/* y [k] becomes (L L')^-1 y. */
static void clothi_qp_back(const clothi_qp *s, double *y) {
    int i, j;
    for (i = 0; i < s->k; i++) {
        const double *row = s->L + s->lstart[i];
        const int     f = s->first[i];
        y[i] = clothi_qp_minus_dot(y[i], row, y + f, i - f) / row[i - f];
    }
    for (i = s->k - 1; i >= 0; i--) {
        const double *row = s->L + s->lstart[i];
        const int     f = s->first[i];
        const double  t = y[i] /= row[i - f];
        for (j = f; j < i; j++) y[j] -= t * row[j - f];
    }
}

/* v [n], minv |G'| lambda before: the sizes of the numbers that each x was made of, at most the
 * largest |x| or |x0|. */
static void clothi_qp_sizes(const cloth_qp *q, const double *x, double *v) {
    double big = 0;
    int    i;
    for (i = 0; i < q->n; i++) big = clothi_max(big, clothi_max(fabs(x[i]), fabs(q->x0[i])));
    for (i = 0; i < q->n; i++)
        v[i] = clothi_max(clothi_min(v[i], big), clothi_max(fabs(x[i]), fabs(q->x0[i])));
}

/* x = x0 - minv G' lambda, slack w = h - G x, and what their rounding is measured by. */
static void clothi_qp_slacks(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p;
    memset(s->u, 0, 2 * (size_t)s->n * sizeof *s->u);           /* and v */
    for (i = 0; i < s->m; i++) {
        const double l = s->lambda[i];
        if (!(l < 0 || l > 0)) continue;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            s->u[q->col[p]] += l * s->g[p];
            s->v[q->col[p]] += fabs(l * s->g[p]);
        }
    }
    for (i = 0; i < s->n; i++) {
        s->x[i] = q->x0[i] - q->minv[i] * s->u[i];
        s->v[i] *= q->minv[i];
    }
    clothi_qp_sizes(q, s->x, s->v);
    for (i = 0; i < s->m; i++) {
        double sum = s->h[i], size = fabs(sum) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            sum -= s->g[p] * s->x[q->col[p]];
            size += fabs(s->g[p]) * s->v[q->col[p]];
        }
        s->w[i] = sum;
        s->size[i] = size;
    }
}

/* ----- block pivoting ------------------------------------------------------------------------ */

/* Solves the equations of the factored rows; refines until their slacks are rounding. */
static int clothi_qp_equations(clothi_qp *s) {
    double before = CLOTHI_HUGE;
    int    i, pass;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    for (i = 0; i < s->k; i++) s->rhs[i] = s->b[s->list[i]];
    for (pass = 0; pass < 6; pass++) {
        double worst = 0;
        clothi_qp_back(s, s->rhs);
        for (i = 0; i < s->k; i++) s->lambda[s->list[i]] += s->rhs[i];
        clothi_qp_slacks(s);
        for (i = 0; i < s->k; i++) {
            const int r = s->list[i];
            s->rhs[i] = -s->w[r];
            worst = clothi_max(worst, fabs(s->w[r]) / s->size[r]);
        }
        if (!(worst < before)) return worst <= CLOTHI_QP_SMALL;
        if (worst <= CLOTHI_QP_ROUNDING) return 1;
        before = 0.5 * worst;
    }
    return before <= 0.5 * CLOTHI_QP_SMALL;
}

typedef struct clothi_qp_wrong {            /* rows on the wrong side of complementarity       */
    int count;
    int stuck;                              /* violated rows that depend on the factored ones  */
} clothi_qp_wrong;

static clothi_qp_wrong clothi_qp_judge(clothi_qp *s) {
    clothi_qp_wrong bad = {0, 0};
    double          big = 0;
    int             i, wrong;
    for (i = 0; i < s->m; i++) big = clothi_max(big, fabs(s->lambda[i]));
    for (i = 0; i < s->m; i++) {
        s->mark[i] = 0;
        if (!s->keep[i]) continue;
        wrong = s->at[i] >= 0 ? s->lambda[i] < -CLOTHI_QP_SMALL * big
                              : s->w[i] < -CLOTHI_QP_SMALL * s->size[i];
        if (wrong && s->at[i] == -2) bad.stuck++;
        else if (wrong) {
            s->mark[i] = 1;
            bad.count++;
        }
    }
    return bad;
}

/* A row outside the factor that looks active must stand well off the span of the factored rows,
 * or it decides where x lies by less than its slack is known to. */
static int clothi_qp_doubtful(clothi_qp *s) {
    double *y = s->rhs;
    int     i, j, e;
    for (i = 0; i < s->m; i++) {
        double pivot = s->adiag[i];
        int    low = s->k;
        if (!s->keep[i] || s->at[i] >= 0 || s->w[i] > CLOTHI_QP_SMALL * s->size[i]) continue;
        if (s->at[i] == -2) return 1;
        memset(y, 0, (size_t)s->k * sizeof *y);
        for (e = s->astart[i]; e < s->astart[i + 1]; e++) {
            const int at = s->at[s->acol[e]];
            if (at >= 0) y[at] = s->aval[e];
            if (at >= 0 && at < low) low = at;
        }
        for (j = low; j < s->k; j++) {
            const double *row = s->L + s->lstart[j];
            const int     f = s->first[j], from = f > low ? f : low;
            y[j] = clothi_qp_minus_dot(y[j], row + (from - f), y + from, j - from) / row[j - f];
            pivot -= y[j] * y[j];
        }
        if (!(pivot > CLOTHI_QP_DEPENDENT * s->adiag[i])) return 1;
    }
    return 0;
}

/* Multipliers that are 0 but for rounding become 0. */
static void clothi_qp_clamp(clothi_qp *s) {
    int i, any = 0;
    for (i = 0; i < s->m; i++)
        if (s->lambda[i] < 0) {
            s->lambda[i] = 0;
            any = 1;
        }
    if (any) clothi_qp_slacks(s);
}

/* Is a row that points much the same way violated more? w: slacks. */
static int clothi_qp_shadowed(const clothi_qp *s, int i, const double *w) {
    const double mine = w[i] * fabs(w[i]) / s->adiag[i];
    int          e;
    for (e = s->astart[i]; e < s->astart[i + 1]; e++) {
        const int    j = s->acol[e];
        const double a = s->aval[e];
        double       other;
        if (!(a > 0) || j == i || !s->keep[j] || !(w[j] < 0)) continue;
        if (a * a < CLOTHI_QP_PARALLEL * s->adiag[i] * s->adiag[j]) continue;
        other = w[j] * fabs(w[j]) / s->adiag[j];
        if (other < mine || (j < i && !(other > mine))) return 1;
    }
    return 0;
}

/* Exchanges all rows on the wrong side at once as long as that lowers their number, or has done so
 * within the last few tries. done: the optimum is in x and lambda; else act is where to go on. */
static cloth_status clothi_qp_pivot(clothi_qp *s, int *done) {
    int best = s->m + 1, patience = CLOTHI_QP_PATIENCE, i;
    *done = 0;
    while (s->iterations < s->most) {
        clothi_qp_wrong bad;
        int             exact;
        if (s->hooks->cancel.fn && s->hooks->cancel.fn(s->hooks->cancel.user))
            return CLOTH_ERR_CANCELLED;
        s->iterations++;
        if (!clothi_qp_factor(s)) return CLOTH_ERR_MEMORY;
        exact = clothi_qp_equations(s);
        bad = clothi_qp_judge(s);
        if (bad.count == 0) {
            *done = !bad.stuck && exact && !clothi_qp_doubtful(s);
            if (*done) clothi_qp_clamp(s);
            break;
        }
        patience = bad.count < best ? CLOTHI_QP_PATIENCE : patience - 1;
        if (bad.count < best) best = bad.count;
        if (patience < 0) break;
        for (i = 0; i < s->m; i++)
            if (s->mark[i]) s->act[i] = s->at[i] < 0 && !clothi_qp_shadowed(s, i, s->w);
    }
    return CLOTH_OK;
}

/* ----- the dual active set, with twice the digits -------------------------------------------- */

static int clothi_qp_start2(clothi_qp *s) {
    const size_t    m = (size_t)s->m, n = (size_t)s->n;
    const cloth_qp *q = s->q;
    clothi_qp_two  *t = (clothi_qp_two *)clothi_qp_take(s->work, CLOTHI_QP_TWOS, 6 * m + 2 * n,
                                                        sizeof *t, 0);
    int             i, e, p, f;
    s->a2 = (clothi_qp_two *)clothi_qp_take(s->work, CLOTHI_QP_A2, (size_t)s->astart[m] + 1,
                                            sizeof *t, 0);
    if (!t || !s->a2) return 0;
    s->h2 = t, s->b2 = t + m, s->lambda2 = t + 2 * m, s->w2 = t + 3 * m, s->rhs2 = t + 4 * m;
    s->ray2 = t + 5 * m, s->x2 = t + 6 * m, s->u2 = s->x2 + n;
    memset(s->a2, 0, (size_t)s->astart[m] * sizeof *t);
    for (i = 0; i < s->m; i++) {
        const double unit = ldexp(1.0, -s->exponent[i]);
        for (e = s->astart[i]; e < s->astart[i + 1]; e++) s->mark[s->acol[e]] = e;
        s->h2[i] = clothi_qp_make(q->h[i] * unit, 0);
        s->b2[i] = clothi_qp_make(0, 0);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int           c = q->col[p];
            const double        a = s->g[p];
            const clothi_qp_two t2 = clothi_qp_product(a, q->minv[c]);
            if (!(q->minv[c] > 0))
                s->h2[i] = clothi_qp_add(s->h2[i],
                                         clothi_qp_product(-q->val[p] * unit, q->x0[c]));
            if (!(a < 0 || a > 0)) continue;
            s->b2[i] = clothi_qp_add(s->b2[i], clothi_qp_product(a, q->x0[c]));
            for (f = s->cstart[c]; f < s->cstart[c + 1]; f++) {
                clothi_qp_two *to = s->a2 + s->mark[s->crow[f]];
                *to = clothi_qp_axpy(*to, t2, s->g[s->centry[f]]);
            }
        }
        s->b2[i] = clothi_qp_add(s->b2[i], clothi_qp_neg(s->h2[i]));
        s->mark[i] = i;
    }
    return 1;
}

/* a_ii with twice the digits. */
static clothi_qp_two clothi_qp_diagonal2(const clothi_qp *s, int i) {
    int e = s->astart[i];
    while (s->acol[e] != i) e++;
    return s->a2[e];
}

/* rhs2 = L^-1 (column of row r); returns what is left of a_rr; *low the first entry not 0. */
static clothi_qp_two clothi_qp_reduce2(clothi_qp *s, int r, clothi_qp_two *y, int *low) {
    clothi_qp_two pivot = clothi_qp_diagonal2(s, r);
    int           e, j, at, k = s->k;
    for (*low = k, e = s->astart[r]; e < s->astart[r + 1]; e++) {
        at = s->at[s->acol[e]];
        if (at >= 0 && at < *low) *low = at;
    }
    memset(y + *low, 0, (size_t)(k - *low) * sizeof *y);
    for (e = s->astart[r]; e < s->astart[r + 1]; e++) {
        at = s->at[s->acol[e]];
        if (at >= 0 && at < k) y[at] = s->a2[e];
    }
    for (j = *low; j < k; j++) {
        const clothi_qp_two *row = s->L2 + s->lstart[j];
        const int            f = s->first[j], from = f > *low ? f : *low;
        y[j] = clothi_qp_div(clothi_qp_minus_dot2(y[j], row + (from - f), y + from, j - from),
                             row[j - f]);
    }
    return clothi_qp_minus_dot2(pivot, y + *low, y + *low, k - *low);
}

/* Row r becomes the last of the factor, unless the square of its distance from the others is at
 * most `least` of its length: 0. -1: no memory. */
static int clothi_qp_append2(clothi_qp *s, int r, double least) {
    const size_t  used = s->lstart[s->k];
    clothi_qp_two pivot;
    int           low;
    s->at[r] = -1;
    pivot = clothi_qp_reduce2(s, r, s->rhs2, &low);
    if (!(pivot.hi > least * s->adiag[r])) {
        s->at[r] = -2;
        return 0;
    }
    s->L2 = (clothi_qp_two *)clothi_qp_take(s->work, CLOTHI_QP_L2,
                                            used + (size_t)(s->k - low + 1), sizeof *s->L2,
                                            used * sizeof *s->L2);
    if (!s->L2) return -1;
    memcpy(s->L2 + used, s->rhs2 + low, (size_t)(s->k - low) * sizeof *s->L2);
    s->L2[used + (size_t)(s->k - low)] = clothi_qp_root(pivot);
    s->first[s->k] = low;
    s->list[s->k] = r;
    s->at[r] = s->k++;
    s->lstart[s->k] = used + (size_t)(s->k - low);
    return 1;
}

/* y [k] becomes L^-T y. */
static void clothi_qp_upper2(const clothi_qp *s, clothi_qp_two *y) {
    int i, j;
    for (i = s->k - 1; i >= 0; i--) {
        const clothi_qp_two *row = s->L2 + s->lstart[i];
        const int            f = s->first[i];
        const clothi_qp_two  t = clothi_qp_neg(y[i] = clothi_qp_div(y[i], row[i - f]));
        for (j = f; j < i; j++) y[j] = clothi_qp_add(y[j], clothi_qp_mul(t, row[j - f]));
    }
}

/* lambda2 of the factored rows from their equations, of all others 0. */
static void clothi_qp_equations2(clothi_qp *s) {
    clothi_qp_two *y = s->rhs2;
    int            i;
    for (i = 0; i < s->k; i++) {
        const clothi_qp_two *row = s->L2 + s->lstart[i];
        const int            f = s->first[i];
        y[i] = clothi_qp_div(clothi_qp_minus_dot2(s->b2[s->list[i]], row, y + f, i - f),
                             row[i - f]);
    }
    clothi_qp_upper2(s, y);
    memset(s->lambda2, 0, (size_t)s->m * sizeof *s->lambda2);
    for (i = 0; i < s->k; i++) s->lambda2[s->list[i]] = y[i];
}

/* Takes row number p out of the factor; rows behind it are factored again. 0: no memory. */
static int clothi_qp_remove2(clothi_qp *s, int p) {
    const int end = s->k;
    int       i;
    s->at[s->list[p]] = -1;
    for (i = p + 1; i < end; i++) s->at[s->list[i]] = -1;
    s->k = p;
    s->refactorizations++;
    for (i = p + 1; i < end; i++)
        if (clothi_qp_append2(s, s->list[i], CLOTHI_QP_DEPENDENT2) < 0) return 0;
    return 1;
}

/* Factors the rows with act in order. 0: no memory. */
static int clothi_qp_factor2(clothi_qp *s, double least) {
    int i, p;
    for (i = 0; i < s->m; i++) s->at[i] = -1;
    s->k = 0;
    s->lstart[0] = 0;
    s->factorizations++;
    for (p = 0; p < s->m; p++)
        if (s->act[s->order[p]] && clothi_qp_append2(s, s->order[p], least) < 0) return 0;
    return 1;
}

/* The rows with act, thinned until they are independent and their multipliers not negative. */
static int clothi_qp_thin2(clothi_qp *s) {
    int i, again = 1;
    while (again) {
        if (!clothi_qp_factor2(s, CLOTHI_QP_START2)) return 0;
        clothi_qp_equations2(s);
        for (i = 0, again = 0; i < s->m; i++) {
            if (s->at[i] >= 0 && s->lambda2[i].hi < 0) again = 1;
            s->act[i] = s->at[i] >= 0 && !(s->lambda2[i].hi < 0);
        }
    }
    return 1;
}

static void clothi_qp_slacks2(clothi_qp *s) {
    const cloth_qp *q = s->q;
    int             i, p;
    memset(s->u2, 0, (size_t)s->n * sizeof *s->u2);
    for (i = 0; i < s->m; i++) {
        if (!(s->lambda2[i].hi > 0)) continue;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            clothi_qp_two *u = s->u2 + q->col[p];
            *u = clothi_qp_axpy(*u, s->lambda2[i], s->g[p]);
        }
    }
    for (i = 0; i < s->n; i++)
        s->x2[i] = clothi_qp_axpy(clothi_qp_make(q->x0[i], 0), s->u2[i], -q->minv[i]);
    for (i = 0; i < s->m; i++) {
        clothi_qp_two sum = s->h2[i];
        double        size = fabs(sum.hi) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int c = q->col[p];
            sum = clothi_qp_axpy(sum, s->x2[c], -s->g[p]);
            size += fabs(s->g[p]) * clothi_max(fabs(s->x2[c].hi), fabs(q->x0[c]));
        }
        s->w2[i] = sum;
        s->size[i] = size;
    }
}

/* The row that is violated most, -1: none. mark[i] == -3: its violation is rounding of the rows
 * that it depends on. */
static int clothi_qp_worst2(const clothi_qp *s) {
    double most = 0, big = 0;
    int    i, worst = -1;
    for (i = 0; i < s->m; i++) big = clothi_max(big, s->lambda2[i].hi);
    for (i = 0; i < s->m; i++) {
        const double v = -s->w2[i].hi;
        if (!s->keep[i] || s->at[i] >= 0 || s->mark[i] == -3) continue;
        if (!(v > CLOTHI_QP_SMALL2 * s->size[i] + CLOTHI_QP_DRIFT2 * big)) continue;
        if (v > most * sqrt(s->adiag[i])) {
            most = v / sqrt(s->adiag[i]);
            worst = i;
        }
    }
    return worst;
}

/* The largest a_ii y_i^2 of the ray y: what the length of G' y is measured by. */
static double clothi_qp_ray_size(const clothi_qp *s, int p) {
    double big = s->adiag[p];
    int    i;
    for (i = 0; i < s->k; i++) {
        const double y = s->ray2[i].hi;
        big = clothi_max(big, y * y * s->adiag[s->list[i]]);
    }
    return big;
}

/* Brings row p in: along the direction in which the factored rows stay equations, lambda_p grows
 * until p holds, or until a multiplier is 0 and its row leaves. CLOTH_OK; *ray: no end to it, ray2
 * (factored rows) and 1 for p are the certificate. */
static cloth_status clothi_qp_bring2(clothi_qp *s, int p, int *ray) {
    clothi_qp_two v = clothi_qp_neg(s->w2[p]), mine = clothi_qp_make(0, 0);
    const double  rounding = CLOTHI_QP_COPY * s->size[p];
    int           i, low, leave;
    for (*ray = 0;;) {
        clothi_qp_two *r = s->ray2, pivot, t = clothi_qp_make(CLOTHI_HUGE, 0);
        int            free_step;
        s->at[p] = -1;
        pivot = clothi_qp_reduce2(s, p, r, &low);
        memset(r, 0, (size_t)low * sizeof *r);
        clothi_qp_upper2(s, r);
        free_step = pivot.hi > CLOTHI_QP_DEPENDENT2 * s->adiag[p];
        if (!free_step && v.hi <= rounding && !(mine.hi > 0)) {
            s->mark[p] = -3;
            return CLOTH_OK;
        }
        if (free_step) t = clothi_qp_div(v, pivot);
        for (i = 0, leave = -1; i < s->k; i++) {
            clothi_qp_two q;
            if (!(r[i].hi > CLOTHI_QP_SMALL2)) continue;
            q = clothi_qp_div(s->lambda2[s->list[i]], r[i]);
            if (q.hi < t.hi) t = q, leave = i;
        }
        if (leave < 0 && !(pivot.hi > CLOTHI_QP_DEPENDENT2 * clothi_qp_ray_size(s, p))) {
            *ray = 1;
            return CLOTH_OK;
        }
        for (i = 0; i < s->k; i++) {
            clothi_qp_two *l = s->lambda2 + s->list[i];
            *l = clothi_qp_add(*l, clothi_qp_neg(clothi_qp_mul(t, r[i])));
            if (l->hi < 0) *l = clothi_qp_make(0, 0);
        }
        mine = clothi_qp_add(mine, t);
        if (free_step) v = clothi_qp_add(v, clothi_qp_neg(clothi_qp_mul(t, pivot)));
        if (leave < 0) break;
        s->lambda2[s->list[leave]] = clothi_qp_make(0, 0);
        if (!clothi_qp_remove2(s, leave)) return CLOTH_ERR_MEMORY;
    }
    if (clothi_qp_append2(s, p, CLOTHI_QP_DEPENDENT2) < 0) return CLOTH_ERR_MEMORY;
    clothi_qp_equations2(s);                /* from the equations: no drift over the steps */
    for (i = 0; i < s->k; i++)
        if (s->lambda2[s->list[i]].hi < 0) s->lambda2[s->list[i]] = clothi_qp_make(0, 0);
    return CLOTH_OK;
}

/* lambda = the certificate, of the rows as given, the largest 1. */
static void clothi_qp_certificate(clothi_qp *s, int p) {
    int i, e = s->exponent[p];
    double big = 0;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    for (i = 0; i < s->k; i++) {
        const int r = s->list[i];
        if (s->ray2[i].hi < 0) s->lambda[r] = ldexp(-s->ray2[i].hi, e - s->exponent[r]);
    }
    s->lambda[p] = 1;
    for (i = 0; i < s->m; i++) big = clothi_max(big, s->lambda[i]);
    for (i = 0; i < s->m; i++) s->lambda[i] /= big;
}

/* Is lambda a proof? u [n] is scratch. */
static int clothi_qp_is_certificate(const cloth_qp *q, const double *lambda, double *u,
                                    cloth_qp_report *rep) {
    double big = 0, sum = 0, size = 0, off = 0;
    int    i, p;
    memset(u, 0, (size_t)q->n * sizeof *u);
    for (i = 0; i < q->m; i++) {
        sum += lambda[i] * q->h[i];
        size += lambda[i] * fabs(q->h[i]);
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            const int    c = q->col[p];
            const double f = q->val[p] * lambda[i], t = f * q->x0[c];
            big = clothi_max(big, fabs(q->val[p]));
            if (q->minv[c] > 0) u[c] += f;
            else {
                sum -= t;
                size += fabs(t);
            }
        }
    }
    for (i = 0; i < q->n; i++) off = clothi_max(off, fabs(u[i]));
    rep->certificate = sum;
    return off <= 1e-10 * big && sum < -CLOTHI_QP_SMALL * size;
}

/* Once more in the common order, so that the bits depend on the set and not on the way to it;
 * unless the rows are too dependent for another order. In doubles where these are enough: so it
 * would have ended, had block pivoting found the set. */
static cloth_status clothi_qp_settle2(clothi_qp *s, int solved) {
    int i, kept = 1;
    memcpy(s->ray2, s->lambda2, (size_t)s->m * sizeof *s->ray2);
    for (i = 0; i < s->m; i++) s->act[i] = s->lambda2[i].hi > 0;
    if (!clothi_qp_factor(s)) return CLOTH_ERR_MEMORY;
    if (solved && clothi_qp_equations(s) && clothi_qp_judge(s).count == 0 &&
        !clothi_qp_doubtful(s)) {
        clothi_qp_clamp(s);
        return CLOTH_OK;
    }
    if (!clothi_qp_factor2(s, CLOTHI_QP_DEPENDENT2)) return CLOTH_ERR_MEMORY;
    clothi_qp_equations2(s);
    for (i = 0; i < s->m; i++)
        if (s->act[i] && (s->at[i] < 0 || s->lambda2[i].hi < 0)) kept = 0;
    if (!kept) memcpy(s->lambda2, s->ray2, (size_t)s->m * sizeof *s->ray2);
    clothi_qp_slacks2(s);
    for (i = 0; i < s->m; i++) s->lambda[i] = s->lambda2[i].hi;
    for (i = 0; i < s->n; i++) s->x[i] = s->x2[i].hi;
    return CLOTH_OK;
}

/* Goldfarb and Idnani's method from the rows with act. */
static cloth_status clothi_qp_active_set(clothi_qp *s, cloth_qp_outcome *outcome,
                                         cloth_qp_report *rep) {
    cloth_status status;
    int          i, p, ray;
    *outcome = CLOTH_QP_MAX_ITERATIONS;
    if (!clothi_qp_start2(s) || !clothi_qp_thin2(s)) return CLOTH_ERR_MEMORY;
    for (i = 0; i < s->m; i++) s->mark[i] = 0;
    for (;;) {
        if (s->hooks->cancel.fn && s->hooks->cancel.fn(s->hooks->cancel.user))
            return CLOTH_ERR_CANCELLED;
        clothi_qp_slacks2(s);
        p = clothi_qp_worst2(s);
        if (p < 0) *outcome = CLOTH_QP_SOLVED;
        if (p < 0 || s->iterations >= s->most) break;
        s->iterations++;
        status = clothi_qp_bring2(s, p, &ray);
        if (status) return status;
        if (!ray) continue;
        *outcome = CLOTH_QP_INFEASIBLE;
        clothi_qp_certificate(s, p);
        if (clothi_qp_is_certificate(s->q, s->lambda, s->u, rep)) return CLOTH_OK;
        /* violated by no more than the rounding of rows that almost contradict it: left out; what
         * that does to the solution, the residual tells */
        *outcome = CLOTH_QP_MAX_ITERATIONS;
        s->mark[p] = -3;
        for (i = 0; i < s->m; i++) s->act[i] = s->at[i] >= 0;
        if (!clothi_qp_thin2(s)) return CLOTH_ERR_MEMORY;
    }
    return clothi_qp_settle2(s, *outcome == CLOTH_QP_SOLVED);
}

/* ----- the call ------------------------------------------------------------------------------ */

/* Residuals of x and lambda as returned, from the rows as given. u [n] and v [n] are scratch. */
static void clothi_qp_residuals(const cloth_qp *q, const double *x, const double *lambda,
                                double *u, double *v, cloth_qp_report *rep) {
    int i, p, overflow = 0;
    memset(u, 0, (size_t)q->n * sizeof *u);
    memset(v, 0, (size_t)q->n * sizeof *v);
    for (i = 0; i < q->m; i++)
        for (p = q->row[i]; p < q->row[i + 1] && lambda[i] > 0; p++) {
            u[q->col[p]] += q->val[p] * lambda[i];
            v[q->col[p]] += fabs(q->val[p] * lambda[i]);
        }
    for (i = 0; i < q->n; i++) {
        const double d = x[i] - q->x0[i], m = q->minv[i];
        const double size = clothi_max(m * v[i], clothi_max(fabs(x[i]), fabs(q->x0[i])));
        v[i] *= m;
        if (size > 0) rep->dual = clothi_max(rep->dual, fabs(d + m * u[i]) / size);
        if (m > 0) rep->objective += 0.5 * d * d / m;
        if (!clothi_finite(d + m * u[i]) || !clothi_finite(size)) overflow = 1;
    }
    clothi_qp_sizes(q, x, v);
    for (i = 0; i < q->m; i++) {
        double sum = q->h[i], size = fabs(sum) + CLOTHI_QP_TINY;
        for (p = q->row[i]; p < q->row[i + 1]; p++) {
            sum -= q->val[p] * x[q->col[p]];
            size += fabs(q->val[p]) * v[q->col[p]];
        }
        rep->primal = clothi_max(rep->primal, -sum / size);
        if (!clothi_finite(sum) || !clothi_finite(size)) overflow = 1;
        if (lambda[i] > 0) {
            rep->complementarity = clothi_max(rep->complementarity, fabs(sum) / size);
            rep->active++;
        }
    }
    rep->residual = clothi_max(rep->primal, clothi_max(rep->dual, rep->complementarity));
    if (overflow) rep->primal = rep->residual = CLOTHI_HUGE;
}

static cloth_status clothi_qp_check_numbers(const cloth_hooks *hooks, const char *name,
                                            const double *a, int n) {
    const ptrdiff_t i = clothi_find_nonfinite(a, (size_t)n);
    if (i < 0) return CLOTH_OK;
    return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "qp.%s[%i] = %g: give it a number", name,
                       (int)i, a[i]);
}

static cloth_status clothi_qp_check(const cloth_hooks *hooks, const cloth_qp *q) {
    cloth_status status;
    int          i, nz;
    if (!q) return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp = NULL: pass a problem");
    if (q->n < 1 || q->n > 0x3fffffff)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.n = %i: give it 1 .. 2^30 unknowns",
                           q->n);
    if (q->m < 0 || q->m > 0x0fffffff)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.m = %i: give it 0 .. 2^28 rows", q->m);
    if (!q->minv || !q->x0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.%s = NULL", q->minv ? "x0" : "minv");
    if (q->m && (!q->row || !q->col || !q->val || !q->h))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.%s = NULL",
                           !q->row ? "row" : !q->col ? "col" : !q->val ? "val" : "h");
    if ((status = clothi_qp_check_numbers(hooks, "minv", q->minv, q->n)) != CLOTH_OK ||
        (status = clothi_qp_check_numbers(hooks, "x0", q->x0, q->n)) != CLOTH_OK)
        return status;
    for (i = 0; i < q->n; i++)
        if (q->minv[i] < 0)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.minv[%i] = %g: an inverse mass is "
                               "not negative", i, q->minv[i]);
    if (!q->m) return CLOTH_OK;
    if (q->row[0] != 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.row[0] = %i: it is 0", q->row[0]);
    for (i = 0; i < q->m; i++)
        if (q->row[i + 1] < q->row[i])
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.row[%i] = %i but qp.row[%i] = %i",
                               i + 1, q->row[i + 1], i, q->row[i]);
    nz = q->row[q->m];
    for (i = 0; i < nz; i++)
        if (q->col[i] < 0 || q->col[i] >= q->n)
            return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "qp.col[%i] = %i but qp.n = %i", i,
                               q->col[i], q->n);
    if ((status = clothi_qp_check_numbers(hooks, "val", q->val, nz)) != CLOTH_OK) return status;
    return clothi_qp_check_numbers(hooks, "h", q->h, q->m);
}

/* Scales the rows; a violated row without a free unknown ends the matter: *violated = its row. */
static cloth_status clothi_qp_scale(clothi_qp *s, int *violated) {
    int i;
    *violated = -1;
    for (i = 0; i < s->m; i++) {
        const int what = clothi_qp_scale_row(s, i);
        if (what == 3)
            return clothi_fail(s->hooks, CLOTH_ERR_ARGUMENT, "qp row %i: |row| or |h| in units of "
                               "its unknowns is out of range (h = %g)", i, s->q->h[i]);
        s->dropped += what == 1;
        if (what == 2 && *violated < 0) *violated = i;
    }
    return CLOTH_OK;
}

/* From the scaled rows back to those given, and the report. */
static void clothi_qp_finish(clothi_qp *s, cloth_qp_outcome outcome, cloth_qp_report *rep) {
    int i;
    rep->outcome = outcome;
    rep->primal = rep->dual = rep->complementarity = rep->residual = rep->objective = 0;
    rep->certificate = 0;
    rep->active = 0;
    if (outcome == CLOTH_QP_INFEASIBLE) {
        if (!clothi_qp_is_certificate(s->q, s->lambda, s->u, rep))
            rep->outcome = CLOTH_QP_MAX_ITERATIONS;
        memcpy(s->x, s->q->x0, (size_t)s->n * sizeof *s->x);
        return;
    }
    for (i = 0; i < s->m; i++) s->lambda[i] = ldexp(s->lambda[i], -s->exponent[i]);
    clothi_qp_residuals(s->q, s->x, s->lambda, s->u, s->v, rep);
}

static cloth_status clothi_qp_run(clothi_qp *s, const cloth_qp_options *o, cloth_qp_report *rep) {
    cloth_status status;
    int          i, done = 0, violated;
    if (!clothi_qp_layout(s))
        return clothi_fail(s->hooks, CLOTH_ERR_MEMORY, "no memory for qp.m = %i", s->m);
    status = clothi_qp_scale(s, &violated);
    if (status) return status;
    memset(s->lambda, 0, (size_t)s->m * sizeof *s->lambda);
    if (violated < 0) {
        clothi_qp_columns(s);
        status = clothi_qp_matrix(s);
        if (status) return status;
        for (i = 0; i < s->m; i++)          /* entries of one column that cancel */
            if (s->keep[i] && !(s->adiag[i] > CLOTHI_QP_CANCELLED)) {
                s->keep[i] = 0;
                s->dropped++;
                if (s->b[i] > CLOTHI_QP_COPY * s->size[i]) violated = i;
            }
    }
    if (violated >= 0) {
        s->lambda[violated] = 1;
        clothi_qp_finish(s, CLOTH_QP_INFEASIBLE, rep);
        return CLOTH_OK;
    }
    clothi_qp_drop_copies(s);
    clothi_qp_order(s);
    for (i = 0; i < s->m; i++) s->w[i] = -s->b[i];
    for (i = 0; i < s->m; i++)
        s->act[i] = s->keep[i] && (o->guess ? o->guess[i] > 0
                                            : s->b[i] > 0 && !clothi_qp_shadowed(s, i, s->w));
    status = clothi_qp_pivot(s, &done);
    if (done) clothi_qp_finish(s, CLOTH_QP_SOLVED, rep);
    if (status == CLOTH_OK && !(done && rep->residual <= o->tolerance)) {
        cloth_qp_outcome outcome;
        rep->precise = 1;
        status = clothi_qp_active_set(s, &outcome, rep);
        if (status == CLOTH_OK) clothi_qp_finish(s, outcome, rep);
        if (rep->outcome == CLOTH_QP_SOLVED && !(rep->residual <= o->tolerance))
            rep->outcome = CLOTH_QP_MAX_ITERATIONS;
    }
    if (status == CLOTH_ERR_MEMORY)
        return clothi_fail(s->hooks, status, "no memory for qp.m = %i", s->m);
    if (status) return clothi_fail(s->hooks, status, "the cancel hook stopped the QP");
    return CLOTH_OK;
}

/* One row of distinct columns: lambda = max(0, (g.x0 - h) / sum minv g^2). 0: not for here. */
static int clothi_qp_one_row(const cloth_qp *q, double *x, double *lambda, cloth_qp_report *rep) {
    double a = 0, b = -q->h[0], l, slack = q->h[0], size = fabs(slack) + CLOTHI_QP_TINY;
    int    p, i;
    if (q->row[1] > 64) return 0;
    for (p = 0; p < q->row[1]; p++) {
        const double g = q->val[p];
        a += g * g * q->minv[q->col[p]];
        b += g * q->x0[q->col[p]];
        for (i = 0; i < p; i++)
            if (q->col[i] == q->col[p]) return 0;
    }
    l = b > 0 ? b / a : 0;
    if (!(a > 1e-100 && a < 1e100) || !(l < 1e100)) return 0;
    if (x) memcpy(x, q->x0, (size_t)q->n * sizeof *x);
    for (p = 0; p < q->row[1]; p++) {
        const int    c = q->col[p];
        const double to = q->x0[c] - q->minv[c] * (l * q->val[p]), d = to - q->x0[c];
        slack -= q->val[p] * to;
        size += fabs(q->val[p]) * clothi_max(fabs(to), fabs(q->x0[c]));
        if (x) x[c] = to;
        if (q->minv[c] > 0) rep->objective += 0.5 * d * d / q->minv[c];
    }
    if (lambda) lambda[0] = l;
    rep->outcome = CLOTH_QP_SOLVED;
    rep->iterations = 1;
    rep->active = l > 0;
    rep->primal = clothi_max(0, -slack / size);
    if (l > 0) rep->complementarity = fabs(slack) / size;
    rep->residual = clothi_max(rep->primal, rep->complementarity);
    return 1;
}

static cloth_status clothi_qp_check_options(const cloth_hooks *hooks, const cloth_qp *q,
                                            const cloth_qp_options *o) {
    if (!(o->tolerance > 0) || !clothi_finite(o->tolerance))
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.tolerance = %g: it is above 0",
                           o->tolerance);
    if (o->max_iterations < 0)
        return clothi_fail(hooks, CLOTH_ERR_ARGUMENT, "options.max_iterations = %i: 0 or more",
                           o->max_iterations);
    if (o->guess) {
        const ptrdiff_t i = clothi_find_nonfinite(o->guess, (size_t)q->m);
        if (i >= 0)
            return clothi_fail(hooks, CLOTH_ERR_NONFINITE, "options.guess[%i] = %g", (int)i,
                               o->guess[i]);
    }
    return CLOTH_OK;
}

CLOTH_API cloth_status cloth_qp_solve(const cloth_qp *qp, const cloth_qp_options *opt, double *x,
                                      double *lambda, cloth_qp_report *rep) {
    cloth_qp_options o = cloth_qp_options_default();
    cloth_qp_report  report;
    cloth_qp_work    own;
    clothi_qp        s;
    cloth_status     status;
    memset(&report, 0, sizeof report);
    if (rep) *rep = report;
    if (opt && opt->cookie != CLOTHI_QP_COOKIE)
        return CLOTH_ERR_UNINIT;
    if (opt) o = *opt;
    status = clothi_qp_check(&o.hooks, qp);
    if (!status) status = clothi_qp_check_options(&o.hooks, qp, &o);
    if (status) return status;
    if (qp->m == 0) {
        if (x) memcpy(x, qp->x0, (size_t)qp->n * sizeof *x);
        report.outcome = CLOTH_QP_SOLVED;
    } else if (qp->m > 1 || !clothi_qp_one_row(qp, x, lambda, &report)) {
        memset(&own, 0, sizeof own);
        own.hooks = o.hooks;
        memset(&s, 0, sizeof s);
        s.q = qp;
        s.hooks = &o.hooks;
        s.work = o.work ? o.work : &own;
        s.m = qp->m, s.n = qp->n;
        s.most = o.max_iterations ? o.max_iterations : 100 + 10 * qp->m;
        status = clothi_qp_run(&s, &o, &report);
        report.iterations = s.iterations;
        report.factorizations = s.factorizations;
        report.refactorizations = s.refactorizations;
        report.dropped = s.dropped;
        if (!status) {
            const ptrdiff_t i = clothi_find_nonfinite(s.x, (size_t)s.n);
            const ptrdiff_t j = clothi_find_nonfinite(s.lambda, (size_t)s.m);
            if (i >= 0 || j >= 0)
                status = clothi_fail(&o.hooks, CLOTH_ERR_NONFINITE, "qp: %s[%i] would be %g: the "
                                     "numbers are out of range", i >= 0 ? "x" : "lambda",
                                     (int)(i >= 0 ? i : j), i >= 0 ? s.x[i] : s.lambda[j]);
        }
        if (status) memset(&report, 0, sizeof report);
        if (!status && x) memcpy(x, s.x, (size_t)s.n * sizeof *x);
        if (!status && lambda) memcpy(lambda, s.lambda, (size_t)s.m * sizeof *lambda);
        clothi_qp_work_clear(&own);
    }
    if (rep) *rep = report;
    return status;
}

/* ===== [7.1] DISTANCE GRID =================================================================== */

/* ===== [7.2] OBSTACLES THAT PENETRATE THEMSELVES ============================================= */

/* ===== [8.1] SCENE =========================================================================== */

/* ===== [8.2] PROXIMITY AND FRICTION ========================================================== */

/* ===== [8.3] IMPACT ZONES ==================================================================== */

/* ===== [8.4] THE CONTACT IN THE STEP ========================================================= */

/* ===== [8.5] QUERIES ========================================================================= */

/* ===== [9.1] CHANGES =========================================================================
 *
 * 0.1.0  first version. MIT licence: the text in LICENSE holds for this file.
 */

#ifdef __cplusplus
}
#endif
#endif /* CLOTHSIM_IMPLEMENTATION */
