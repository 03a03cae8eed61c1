/* test_tangent.c - the dot-product test where the kit has no tangent of its own: LEAPFROG
 * with its impact zones, and implicit steps in contact. A tangent goes forwards: forces by rows of
 * their Jacobian (the vjp of unit vectors), zones by their KKT systems solved forwards; implicit
 * steps by that Jacobian, not symmetric, factored dense, with the anchors of friction. Weights
 * times tangent are what the adjoint finds for the same direction, to rounding.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_tangent.c -lm */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "clothsim_grad.h"
#include "test.h"
#include "host.h"
#include "grad_touch.h"

enum { ROOM = 3 * 64, STEPS = 20, ROWS = 400 };

typedef struct tangent {
    touch       t;
    clothi_grad g;
    int         n;                          /* 3 nv                                            */
    double      w[STEPS + 1][2][ROOM];      /* of the loss, by x and v of each state           */
    double      dx[ROOM], dv[ROOM];
    int         zones;                      /* substeps with rows                              */
} tangent;

static tangent T;

static void weigh(int k, const double *x, const double *v, double *gx, double *gv, void *user) {
    tangent *q = (tangent *)user;
    int      i;
    (void)x, (void)v;
    for (i = 0; i < q->n; i++) {
        gx[i] = q->w[k][0][i] = touch_noise(77u + (unsigned)(k * q->n + i));
        gv[i] = q->w[k][1][i] = 0.01 * touch_noise(99991u + (unsigned)(k * q->n + i));
    }
}

static double along(const double *a, const double *b, int n) {
    double sum = 0;
    int    i;
    for (i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* v of kick `c` of which x, v, v' are: dv goes on. */
static void kick(tangent *q, double c, double hs, const double *x, const double *v,
                 const double *after) {
    clothi_grad *g = &q->g;
    double       next[ROOM] = {0};
    int          i;
    for (i = 0; i < q->n; i++) {
        memset(g->lx, 0, (size_t)q->n * sizeof(double));
        memset(g->lv, 0, (size_t)q->n * sizeof(double));
        g->lv[i] = 1;
        clothi_leap_impulse(g, c, v, after);
        CHECK(clothi_leap_back(g, hs, x, v, 0) == CLOTH_OK);
        next[i] = along(g->lx, q->dx, q->n) + along(g->lv, q->dv, q->n);
    }
    memcpy(q->dv, next, sizeof next);
}

/* What row r of those that pushed is moved by: d [9] of d{normal, w, bound, speed}. */
static void row_moves(tangent *q, const clothi_rows *z, const clothi_passes *p, int r,
                      const double *start, double *d) {
    clothi_grad *g = &q->g;
    const int    pass = z->row[r].pass;
    int          i;
    for (i = 0; i < CLOTH_ROW_RATES; i++) {
        memset(z->rate, 0, (size_t)z->n * CLOTH_ROW_RATES * sizeof(double));
        memset(g->lx, 0, (size_t)q->n * sizeof(double));
        memset(g->np, 0, (size_t)q->n * sizeof(double));
        z->rate[CLOTH_ROW_RATES * r + i] = 1;
        CHECK(!clothi_rows_made(g, z, p, pass, g->lx));
        d[i] = along(g->np, start, q->n) + along(g->lx, p->d + pass * q->n, q->n);
    }
}

/* A dense system by elimination with pivots; b becomes x. */
static void solve(double (*A)[ROWS], double *b, int n) {
    int i, j, k;
    for (k = 0; k < n; k++) {
        int p = k;
        for (i = k; i < n; i++)
            if (fabs(A[i][k]) > fabs(A[p][k])) p = i;
        for (j = 0; j < n; j++) {
            const double t = A[k][j];
            A[k][j] = A[p][j], A[p][j] = t;
        }
        { const double t = b[k]; b[k] = b[p], b[p] = t; }
        for (i = k + 1; i < n; i++) {
            const double f = A[i][k] / A[k][k];
            for (j = k; j < n; j++) A[i][j] -= f * A[k][j];
            b[i] -= f * b[k];
        }
    }
    for (i = n - 1; i >= 0; i--) {
        for (j = i + 1; j < n; j++) b[i] -= A[i][j] * b[j];
        b[i] /= A[i][i];
    }
}

/* One program forwards: d [n] of x* becomes that of x', whose rows move by move [rows x 9]:
 *   G dx' = db - dG x',   M (dx' - dx*) = G' dlambda + dG' lambda */
static void program(tangent *q, const clothi_rows *z, int speeds, const double *x,
                    double (*move)[CLOTH_ROW_RATES], double *d) {
    static double A[ROWS][ROWS], b[ROWS];
    const double *mass = q->g.s->params.mass;
    int           list[ROWS], m = 0, r, i, k, p;
    for (r = 0; r < z->n; r++)
        if (clothi_row_pushes(z->row + r, speeds)) list[m++] = r;
    for (r = 0; r < m; r++) {               /* dG' lambda/m joins dx* */
        const cloth_contact_row *row = z->row + list[r];
        for (i = 0; i < row->n; i++)
            for (k = 0; row->v[i] < q->n / 3 && k < 3; k++)
                d[3 * row->v[i] + k] += (speeds ? row->impulse : row->multiplier) /
                                        mass[row->v[i]] *
                                        (row->w[i] * move[list[r]][k] +
                                         row->normal[k] * move[list[r]][3 + i]);
    }
    for (r = 0; r < m; r++) {
        const cloth_contact_row *row = z->row + list[r];
        b[r] = move[list[r]][7 + speeds];
        for (i = 0; i < row->n; i++)
            for (k = 0; row->v[i] < q->n / 3 && k < 3; k++)
                b[r] -= row->w[i] * row->normal[k] * d[3 * row->v[i] + k] +
                        (row->w[i] * move[list[r]][k] + row->normal[k] * move[list[r]][3 + i]) *
                            x[3 * row->v[i] + k];
        for (p = 0; p < m; p++) A[r][p] = clothi_row_pair(q->g.s, row, z->row + list[p]);
    }
    solve(A, b, m);
    for (r = 0; r < m; r++) {
        const cloth_contact_row *row = z->row + list[r];
        for (i = 0; i < row->n; i++)
            for (k = 0; row->v[i] < q->n / 3 && k < 3; k++)
                d[3 * row->v[i] + k] += b[r] * row->w[i] * row->normal[k] / mass[row->v[i]];
    }
}

/* The zones of a drift from `start`, d of the x where it began; dx, dv of what they were given go
 * on. Rows of later passes move with where these began. */
static void zones(tangent *q, double hs, const double *x, const double *next,
                  const double *start) {
    static double move[ROWS][CLOTH_ROW_RATES];
    cloth_sim    *s = q->g.s;
    const size_t  bytes = (size_t)q->n * sizeof(double);
    double        end[ROOM];
    clothi_passes p = {0, NULL, NULL};
    clothi_rows   z;
    int           r, at, frozen;
    if (memcmp(x + 2 * q->n, next, 2 * bytes) == 0) return;
    q->zones++;
    memset(&z, 0, sizeof z);
    CHECK(clothi_passes_open(&q->g, hs, x, next, &p, &z, &frozen) == CLOTH_OK && !frozen);
    memcpy(p.d, q->dx, bytes);
    for (at = 1; at <= p.n; at++) {
        CHECK(clothi_leap_resolve(&q->g, hs, x, at % p.n, &z) == CLOTH_OK && z.n <= ROWS);
        for (r = 0; r < z.n; r++)
            if (clothi_row_pushes(z.row + r, 0)) row_moves(q, &z, &p, r, start, move[r]);
        memcpy(end, q->dx, bytes);
        program(q, &z, 0, s->w.x, move, end);
        if (at < p.n) memcpy(p.d + at * q->n, end, bytes);
    }
    program(q, &z, 1, s->w.trial, move, q->dv);
    memcpy(q->dx, end, bytes);
    clothi_rows_close(&q->g, &z);
    clothi_free(&q->g.t->hooks, p.x);
}

/* A step along its path. */
static void step(tangent *q, int k) {
    clothi_grad  *g = &q->g;
    const size_t  n = g->t->nv3, each = clothi_tape_each(g->t);
    const double  h = g->t->step[k].h, *end = (const double *)(const void *)g->t->end;
    const unsigned char *slot = g->t->step[k].slot;
    double        start[ROOM], hs;
    int           j, i, m;
    if (k + 1 < g->t->n) end = (const double *)(const void *)g->t->step[k + 1].slot;
    CHECK(clothi_grad_put(g, k, slot) == CLOTH_OK);
    CHECK(clothi_tape_trace(g->t, each * (size_t)g->t->step[k].substeps));
    CHECK(clothi_grad_replay(g, k, CLOTHI_TAPE_TRACE) == CLOTH_OK);
    CHECK(clothi_grad_put(g, k, slot) == CLOTH_OK);
    m = g->t->traced - 1, hs = h / m;
    for (j = 0; j <= m; j++) {
        const double *x = g->t->trace + each * (size_t)j, *v = x + n;
        clothi_input(g->s, hs, (double)j / m, (double)(j + 1) / m);
        g->s->in.x = x, g->s->in.v = v;
        g->s->in.share[1] = g->s->in.share[0];
        kick(q, j == 0 || j == m ? 0.5 * hs : hs, hs, x, v,
             j < m ? v + 2 * n : end + n + CLOTHI_PAD8(n * 8) / 8);
        if (j == m) break;
        g->s->in.share[1] = (double)(j + 1) / m;
        memcpy(start, q->dx, sizeof start);
        for (i = 0; i < q->n; i++) q->dx[i] += hs * q->dv[i];
        if (g->s->contact_on) zones(q, hs, x, x + each, start);
    }
    if (g->s->contact_on) g->s->contact.rollback(g->s->contact.user, NULL);
}

/* --- implicit steps in contact: dense, the state of its anchors among what moves --- */

typedef struct memories {                   /* d of the anchors                                */
    int           n;
    clothi_anchor m[ROWS];
} memories;

/* What a vjp of contact got for anchors before the substep, times theirs; the list is emptied. */
static double by_anchors(clothi_adjoint *to, const memories *d) {
    double sum = 0;
    int    i, j;
    for (i = 0; i < to->nafter; i++)
        for (j = 0; j < d->n; j++)
            if (clothi_order(to->after + i, d->m + j, 4) == 0)
                sum += to->after[i].gap * d->m[j].gap +
                       along(to->after[i].slip, d->m[j].slip, 3);
    to->nafter = 0;
    return sum;
}

static void substep_open(tangent *q, int k, clothi_line *line) {
    clothi_grad *g = &q->g;
    const void  *end = k + 1 < g->t->n ? g->t->step[k + 1].slot : g->t->end;
    CHECK(clothi_grad_put(g, k, g->t->step[k].slot) == CLOTH_OK);
    CHECK(clothi_keep(g->s) == CLOTH_OK);
    CHECK(clothi_line_open(g->s, g->t->step + k, 0, 1, (const double *)end, line) == CLOTH_OK);
}

/* d [n] of x' from that of x^n, by J dx' = M/eta^2 dy - dF. */
static void implicit_solve(tangent *q, clothi_check *c, clothi_line *line, const memories *d,
                           double *out) {
    static double A[ROWS][ROWS];
    clothi_grad  *g = &q->g;
    cloth_sim    *s = g->s;
    double        a[ROOM], most;
    int           i, negative;
    memset(a, 0, sizeof a);
    CHECK(clothi_tangent_terms(g, c, &line->goal.e, 0, s->nterms, c->dx, c->dv) == CLOTH_OK);
    for (i = 0; i < q->n; i++)
        out[i] = line->weight * s->params.mass[i / 3] *
                 (line->yx * c->dx[i] + line->yv * c->dv[i] + line->yp * c->dp[i] +
                  line->yw * c->dq[i]) - g->q[i];
    line->goal.e.x = s->w.x;
    CHECK(clothi_grad_assemble(g, line, &most) == CLOTH_OK);
    CHECK(clothi_grad_matrices(g, line, &negative) == CLOTH_OK && !negative);
    line->goal.e.x = s->w.x;
    for (i = 0; i < q->n; i++) {
        cloth_vjp to;
        memset(&to, 0, sizeof to);
        a[i] = 1;
        CHECK(clothi_grad_apply(g, &line->goal.e, a, A[i]) == CLOTH_OK);
        memset(g->lx, 0, (size_t)q->n * sizeof(double));
        to.x_n = g->lx;
        CHECK(s->contact.vjp(s->contact.user, &line->goal.e, a, &to) == CLOTH_OK);
        out[i] -= along(g->lx, c->dx, q->n) + by_anchors(q->t.c->adjoint, d);
        a[i] = 0;
        if (!(s->fixed[i / 3] >> i % 3 & 1)) continue;
        memset(A[i], 0, sizeof A[i]);
        A[i][i] = 1, out[i] = 0;
    }
    solve(A, out, q->n);
}

/* The anchors of keys in *next, from those before. */
static void anchors(tangent *q, const clothi_line *line, const double *dx, const double *end,
                    const memories *d, memories *next) {
    clothi_grad    *g = &q->g;
    cloth_sim      *s = g->s;
    clothi_adjoint *to = q->t.c->adjoint;
    int             i, k, j;
    for (i = 0; i < next->n; i++)
        for (k = 0; k < 4; k++) {
            double   *at = k ? next->m[i].slip + k - 1 : &next->m[i].gap;
            cloth_vjp v;
            CHECK(CLOTHI_ROOM(to, after, next->n) == CLOTH_OK);
            for (j = 0; j < next->n; j++) {
                memset(to->after + j, 0, sizeof *to->after);
                to->after[j].key = next->m[j].key;
            }
            to->nafter = next->n;
            *(k ? to->after[i].slip + k - 1 : &to->after[i].gap) = 1;
            memset(&v, 0, sizeof v);
            memset(g->lx, 0, (size_t)q->n * sizeof(double));
            memset(g->lv, 0, (size_t)q->n * sizeof(double));
            v.x_n = g->lx, v.x = g->lv;
            CHECK(s->contact.vjp(s->contact.user, &line->goal.e, NULL, &v) == CLOTH_OK);
            *at = along(g->lx, dx, q->n) + along(g->lv, end, q->n) + by_anchors(to, d);
        }
}

static void implicit_step(tangent *q, clothi_check *c, int k, memories *d) {
    static memories next;
    cloth_collide  *contact = q->t.c;
    clothi_line     line;
    double          end[ROOM] = {0}, dv;
    int             i;
    substep_open(q, k, &line);
    CHECK(clothi_line_close(q->g.s, &line) == CLOTH_OK);
    memset(&next, 0, sizeof next);
    next.n = contact->nnext;
    CHECK(next.n <= ROWS);
    for (i = 0; i < next.n; i++) next.m[i].key = contact->next[i].key;
    substep_open(q, k, &line);
    contact->adjoint->nafter = 0;
    implicit_solve(q, c, &line, d, end);
    anchors(q, &line, c->dx, end, d, &next);
    q->zones += next.n > 0;
    for (i = 0; i < q->n; i++) {
        dv = line.vx * end[i] + line.vn * c->dx[i] + line.vp * c->dp[i];
        c->dp[i] = c->dx[i], c->dq[i] = c->dv[i], c->dx[i] = end[i], c->dv[i] = dv;
    }
    *d = next;
}

static void implicit_walk(tangent *q, double *forwards) {
    static memories d;
    static double   dp[ROOM], dq[ROOM];
    clothi_check    c;
    int             k;
    memset(&c, 0, sizeof c);
    memset(&d, 0, sizeof d);
    memset(dp, 0, sizeof dp), memset(dq, 0, sizeof dq);
    c.cause[2].name = "x0";                 /* gravity stays: a direction of size 0        */
    c.s = q->g.s, c.dx = q->dx, c.dv = q->dv, c.dp = dp, c.dq = dq;
    for (k = 0; k < q->t.steps; k++) {
        implicit_step(q, &c, k, &d);
        *forwards += along(q->w[k + 1][0], q->dx, q->n) + along(q->w[k + 1][1], q->dv, q->n);
    }
}

static double dot_product(unsigned seed, int by) {
    static double     x0[ROOM], v0[ROOM];
    cloth_tape       *tape = NULL;
    cloth_grad        out;
    cloth_grad_report rep;
    unsigned char    *block = NULL;
    double            forwards = 0, back;
    int               k, i;
    memset(&T, 0, sizeof T);
    memset(&out, 0, sizeof out);
    T.t = touch_make(seed);
    T.t.pins = 0, T.t.substeps = 1, T.t.bdf2 = by == CLOTH_INTEGRATOR_BDF2;
    T.t.leapfrog = by == CLOTH_INTEGRATOR_LEAPFROG;
    if (T.t.leapfrog) T.t.steps = 6;
    (void)touch_run(&T.t, &tape);
    T.n = 3 * T.t.mesh->nv;
    CHECK(T.n <= ROOM && T.t.failed == 0);
    out.x0 = x0, out.v0 = v0;
    tape->opt.tolerance = 1e-13;            /* residuals of 20 solves add up */
    CHECK(cloth_grad_backward(tape, weigh, &T, &out, &rep) == CLOTH_OK && rep.valid);
    for (i = 0; i < T.n; i++) {
        T.dx[i] = touch_noise(5u + (unsigned)i);
        T.dv[i] = touch_noise(505u + (unsigned)i);
    }
    back = along(x0, T.dx, T.n) + along(v0, T.dv, T.n);
    CHECK(clothi_grad_open(&T.g, tape, &out, &rep, &block) == CLOTH_OK);
    tape->mode = CLOTHI_TAPE_DEAF;
    forwards = along(T.w[0][0], T.dx, T.n) + along(T.w[0][1], T.dv, T.n);
    for (k = 0; T.t.leapfrog && k < T.t.steps; k++) {
        step(&T, k);
        forwards += along(T.w[k + 1][0], T.dx, T.n) + along(T.w[k + 1][1], T.dv, T.n);
    }
    if (!T.t.leapfrog) implicit_walk(&T, &forwards);
    CHECK(clothi_grad_adjoint(&T.g, CLOTH_ADJOINT_END, 0) == CLOTH_OK);
    tape->mode = CLOTHI_TAPE_RECORD;
    clothi_tape_free(tape, T.g.krylov);
    cloth_matrix_destroy(T.g.elastic);
    cloth_pattern_destroy(T.g.pattern);
    clothi_tape_free(tape, T.g.here);
    clothi_tape_free(tape, block);
    cloth_tape_destroy(tape);
    touch_close(&T.t);
    printf("  %-8s %17.10e %17.10e  %.1e, %d substeps in contact\n", touch_body[T.t.body], back,
           forwards, fabs(back / forwards - 1), T.zones);
    return fabs(back - forwards) / fmax(fabs(back), fabs(forwards));
}

static void leapfrog_zones(void) {
    static const unsigned seed[] = {1, 0, 2, 3};      /* no pins */
    int                   i;
    for (i = 0; i < (test_quick() ? 1 : test_full() ? 4 : 3); i++) {
        CHECK(dot_product(seed[i], CLOTH_INTEGRATOR_LEAPFROG) <= 1e-10);
        CHECK(T.zones > 0);
    }
}

static void implicit_contact(void) {
    static const unsigned seed[] = {1, 2, 5, 3, 4};
    int                   i;
    for (i = 0; i < (test_quick() ? 1 : test_full() ? 5 : 3); i++) {
        CHECK(dot_product(seed[i], CLOTH_INTEGRATOR_EULER) <= 1e-10);
        CHECK(T.zones > 0);
        CHECK(dot_product(seed[i], CLOTH_INTEGRATOR_BDF2) <= 1e-10);
    }
}

/* 1 to 4 in turn. */
static int asks(void *user) {
    const cloth_sim *s = ((const cloth_collide *)user)->sim;
    return 1 + (int)(s->state.t / 0.01 + 0.5) % 4;
}

static void asking(cloth_sim *sim) { sim->contact.substeps = asks; }

/* Each step of as many substeps as contact asks for: against differences, and with less memory. */
static void asked(void) {
    static touch_graded g[2];
    int                 i, by, failed = 0;
    for (i = 0; i < (test_quick() ? 1 : 2); i++) {
        touch t = touch_make(3u - (unsigned)i);
        t.substeps = 0, t.opened = asking, t.bdf2 = i;
        if (!i) t.steps = 12;
        touch_grade(g, t, 0);
        touch_grade(g + 1, t, g->rep.bytes - g->rep.bytes / 20);
        CHECK(g->status == CLOTH_OK && g->rep.valid && g->t.contacts > 0);
        CHECK(g[1].status == CLOTH_OK && g[1].rep.replayed > 0 && g->rep.replayed == 0);
        CHECK(memcmp(g->r.x0, g[1].r.x0, sizeof g->r.x0) == 0);
        CHECK(memcmp(g->r.obstacle, g[1].r.obstacle, sizeof g->r.obstacle) == 0);
        for (by = TOUCH_START; by <= TOUCH_REST; by++) {
            double       error;
            const double a = touch_along(&g->r, &g->t, by);
            CHECK_REL(a, touch_difference(&g->t, by, 1e-3, &error, &failed), 1e-4);
        }
        CHECK(failed == 0);
        touch_close(&g[0].t), touch_close(&g[1].t);
    }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(leapfrog_zones);
    RUN(implicit_contact);
    RUN(asked);
    return TEST_END();
}
