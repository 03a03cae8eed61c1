/* test_pinch.c - cloth between two parts of a body that penetrates itself: held in order while the
 * parts close and pass each other, counted, listed, let go when they open; nothing let in where
 * parts sweep over it; out by the side that it came in by; an edge that a part is through is led;
 * no bit of difference where no two parts come near; snapshots and workers in a pinch; what it
 * pulls, backwards.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_pinch.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "shapes.h"
#include "exact.h"
#include "stage.h"
#include "edges.h"
#include "host.h"
#include "reference.h"
#include <limits.h>

#define T    2e-3                           /* m, contact thickness                            */
#define H    (1.0 / 60)
#define MOST 512

/* --- the body: two plates as one mesh, each closed, of n x n squares on their six sides --- */

static void plate(shape *s, int n, double size, double y, double thick) {
    const int first = s->nv;
    int       i, j, k;
    shape_room(s, s->nv + 2 * (n + 1) * (n + 1), s->nf + 4 * n * n + 8 * n);
    for (k = 0; k < 2; k++)
        for (j = 0; j <= n; j++)
            for (i = 0; i <= n; i++)
                (void)shape_vertex(s, size * (i / (double)n - 0.5), y + k * thick,
                                   size * (j / (double)n - 0.5));
#define AT(i, j, k) (first + ((k) * (n + 1) + (j)) * (n + 1) + (i))
    for (j = 0; j < n; j++)
        for (i = 0; i < n; i++) {
            shape_face(s, AT(i, j, 1), AT(i, j + 1, 1), AT(i + 1, j, 1));
            shape_face(s, AT(i + 1, j, 1), AT(i, j + 1, 1), AT(i + 1, j + 1, 1));
            shape_face(s, AT(i, j, 0), AT(i + 1, j, 0), AT(i, j + 1, 0));
            shape_face(s, AT(i + 1, j, 0), AT(i + 1, j + 1, 0), AT(i, j + 1, 0));
        }
    for (i = 0; i < n; i++) {
        shape_face(s, AT(i, 0, 0), AT(i, 0, 1), AT(i + 1, 0, 0));
        shape_face(s, AT(i + 1, 0, 0), AT(i, 0, 1), AT(i + 1, 0, 1));
        shape_face(s, AT(i, n, 0), AT(i + 1, n, 0), AT(i, n, 1));
        shape_face(s, AT(i + 1, n, 0), AT(i + 1, n, 1), AT(i, n, 1));
        shape_face(s, AT(0, i, 0), AT(0, i + 1, 0), AT(0, i, 1));
        shape_face(s, AT(0, i + 1, 0), AT(0, i + 1, 1), AT(0, i, 1));
        shape_face(s, AT(n, i, 0), AT(n, i, 1), AT(n, i + 1, 0));
        shape_face(s, AT(n, i + 1, 0), AT(n, i, 1), AT(n, i + 1, 1));
    }
#undef AT
}

static int squares = 6;                     /* along a plate                                   */

/* Plates of 0.12 m, `room` apart around y = 0. */
static void plates(shape *s, double room) {
    memset(s, 0, sizeof *s);
    plate(s, squares, 0.12, -0.5 * room - 0.01, 0.01);
    plate(s, squares, 0.12, 0.5 * room, 0.01);
}

typedef struct scene {
    stage s;
    shape body;
    int   id, layers, half;                 /* half: vertices of a layer                       */
} scene;

/* `layers` sheets of 0.2 m one over the other between the plates, hung up by their corners. */
static void open_scene(scene *q, int layers, double room, int flag, const cloth_hooks *hooks) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    cloth_mesh         *part[3], *all;
    cloth_pin           pins[12];
    int                 i, k;
    memset(q, 0, sizeof *q);
    for (k = 0; k < layers; k++) {
        if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 9, 9, 0.2, 0.2, part + k)) exit(2);
        for (i = 0; i < part[k]->nv; i++) {
            double *x = part[k]->x + 3 * i;
            x[0] -= 0.1, x[2] -= 0.1;
            x[1] = 1.5e-3 * (k - 0.5 * (layers - 1));
        }
    }
    q->half = part[0]->nv;
    if (layers == 1) all = part[0];
    else {
        if (cloth_mesh_merge(NULL, part, layers, &all)) exit(2);
        for (k = 0; k < layers; k++) cloth_mesh_destroy(NULL, part[k]);
    }
    q->layers = layers;
    stage_cloth(&q->s, all);
    q->s.desc.part = all->part;
    q->s.contact.thickness = T;
    if (hooks) q->s.desc.hooks.parallel = hooks->parallel;
    memset(pins, 0, sizeof pins);
    for (i = 0; i < 4 * layers; i++) {
        static const int corner[4] = {0, 8, 72, 80};
        pins[i].vertex = q->half * (i / 4) + corner[i % 4], pins[i].axes = CLOTH_AXIS_ALL;
    }
    q->s.desc.npins = 4 * layers, q->s.desc.pins = pins;
    if (!stage_start(&q->s)) exit(2);
    plates(&q->body, room);
    d.nv = q->body.nv, d.x = q->body.x, d.nf = q->body.nf, d.faces = q->body.faces;
    d.self_penetrating = flag;
    q->id = stage_add(&q->s, &d);
}

static void close_scene(scene *q) {
    shape_free(&q->body);
    stage_end(&q->s);
}

/* The plates `room` apart at the end of the next step, shifted sideways by `side`. */
static void plates_at(scene *q, double room, double side) {
    shape m;
    int   i;
    plates(&m, room);
    for (i = 0; i < m.nv; i++) m.x[3 * i] += side * (2 * i < m.nv ? 1 : -1);
    memcpy(q->s.thing[q->id].next, m.x, 3 * (size_t)m.nv * sizeof(double));
    shape_free(&m);
}

/* From 10 mm to `least` in 20 steps, 10 steps there, and back. */
static double room_at(int step, double least) {
    const double part = step < 20 ? 1 - step / 20.0 : step < 30 ? 0 : step < 50 ? (step - 30) / 20.0
                                                                                 : 1;
    return least + part * (10e-3 - least);
}

/* --- what holds say --- */

/* Points of a hold on the body as this file has it, m their direction; 0: out of range. */
static int hold_points(const scene *q, const cloth_hold *h, double *a, double *m) {
    const stage_thing *t = q->s.thing + q->id;
    double             n[2][3];
    int                i, k;
    for (k = 0; k < 2; k++) {
        const double *p[3];
        double        e[2][3], size = 0;
        if (h->face[k] < 0 || h->face[k] >= q->body.nf) return 0;
        for (i = 0; i < 3; i++) p[i] = t->x + 3 * q->body.faces[3 * h->face[k] + i];
        for (i = 0; i < 3; i++) {
            a[3 * k + i] = h->weight[k][0] * p[0][i] + h->weight[k][1] * p[1][i] +
                           h->weight[k][2] * p[2][i];
            e[0][i] = p[1][i] - p[0][i], e[1][i] = p[2][i] - p[0][i];
        }
        for (i = 0; i < 3; i++) {
            const int j = (i + 1) % 3, l = (i + 2) % 3;
            n[k][i] = e[0][j] * e[1][l] - e[0][l] * e[1][j];
            size += n[k][i] * n[k][i];
        }
        for (i = 0; i < 3; i++) n[k][i] /= sqrt(size);
    }
    for (i = 0; i < 3; i++) m[i] = n[0][i] - n[1][i];
    a[6] = sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2]);
    for (i = 0; i < 3; i++) m[i] /= a[6];
    return 1;
}

/* Every hold is of a vertex that lies between two faces of the two plates that look at each other,
 * at its share of the way; one of each vertex, in their order. Returns their number. */
static int examine_holds(const scene *q) {
    static cloth_hold hold[MOST];
    int               i, k, n = -1, last = -1, few = -1;
    CHECK(cloth_collide_holds(q->s.c, MOST, hold, &n) == CLOTH_OK && n <= MOST);
    CHECK(n == cloth_collide_last(q->s.c).held);
    CHECK(cloth_collide_holds(q->s.c, 0, NULL, &few) == CLOTH_OK && few == n);
    for (i = 0; i < n; i++) {
        const cloth_hold *h = hold + i;
        double            a[7], m[3], way = 0, room = 0;
        CHECK(h->vertex >= 0 && h->vertex < q->s.mesh->nv && h->slot == 0);
        for (k = 0; k < 2; k++) {
            CHECK_NEAR(h->weight[k][0] + h->weight[k][1] + h->weight[k][2], 1, 1e-12);
            CHECK(fmin(h->weight[k][0], fmin(h->weight[k][1], h->weight[k][2])) > -1e-12);
        }
        if (h->face[0] == h->face[1] && h->share == 0) continue;    /* goes out, between nothing */
        CHECK(h->share > 0 && h->share < 1);
        if (!CHECK(hold_points(q, h, a, m))) continue;
        CHECK((2 * h->face[0] < q->body.nf) != (2 * h->face[1] < q->body.nf));
        CHECK(a[6] > 1.9);                  /* plane plates: straight at each other */
        for (k = 0; k < 3; k++) {
            way += (q->s.state->x[3 * h->vertex + k] - a[k]) * m[k];
            room += (a[3 + k] - a[k]) * m[k];
        }
        /* dragged there, not nailed; layers keep each other off besides */
        CHECK_NEAR(way, h->share * room, q->layers == 1 ? 0.1 * T : T);
        last = h->vertex > last ? h->vertex : last;
    }
    return n;
}

/* --- one pinch --- */

typedef struct seen {
    int    held, faces, crossings, miscounted, failed, disorder;
    int    left, exempt;                    /* of holds, of pairs at the end                   */
    double gap, stretch;
} seen;

/* Vertices that are held and not over the one of the layer below. */
static int disorder(const scene *q) {
    static cloth_hold hold[MOST];
    static char       held[MOST];
    int               i, n = 0, bad = 0;
    memset(held, 0, sizeof held);
    (void)cloth_collide_holds(q->s.c, MOST, hold, &n);
    for (i = 0; i < n; i++) held[hold[i].vertex] = 1;
    for (i = q->half; i < q->s.mesh->nv; i++) {
        const double d = q->s.state->x[3 * i + 1] - q->s.state->x[3 * (i - q->half) + 1];
        if (held[i] && held[i - q->half]) bad += !(d > 0);
    }
    return bad;
}

static seen pinch(int layers, double least, int after) {
    scene q;
    seen  w;
    int   i, n;
    memset(&w, 0, sizeof w);
    open_scene(&q, layers, room_at(0, least), 1, NULL);
    for (i = 1; i <= 50 + after; i++) {
        cloth_report r;
        plates_at(&q, room_at(i, least), 0);
        CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
        if (cloth_step(q.s.sim, H, &r)) {
            w.failed++;
            break;
        }
        memcpy(q.s.thing[q.id].x, q.s.thing[q.id].next, 3 * (size_t)q.body.nv * sizeof(double));
        (void)stage_examine(&q.s);
        n = examine_holds(&q);
        w.held = n > w.held ? n : w.held;
        w.left = n;
        CHECK((n > 0) == (cloth_collide_last(q.s.c).exempt_faces > 0));
        n = cloth_collide_last(q.s.c).exempt_faces;
        w.faces = n > w.faces ? n : w.faces;
        n = stage_crossings(&q.s);
        w.crossings = n > w.crossings ? n : w.crossings;
        w.miscounted += !stage_parity(&q.s);
        w.disorder += disorder(&q);
        w.stretch = fmax(w.stretch, edges_longest(&q.s.desc, q.s.state->x));
        if (getenv("SHOW_STEPS"))
            printf("      %3d room %7.3f mm: held %d faces %d pairs %d exempt %d newton %d, "
                   "%.0f ms\n",
                   i, 1e3 * room_at(i, least), w.left, cloth_collide_last(q.s.c).exempt_faces, n,
                   r.exempt_pairs, r.newton, r.ms.total);
    }
    w.exempt = stage_crossings(&q.s);
    CHECK(cloth_collide_gap(q.s.c, 0.01, &w.gap) == CLOTH_OK);
    printf("    %d layers, plates %5.2f mm: held %d, faces %d, crossings %d, at the end %d held, "
           "%d crossings, gap %.2f mm, edges %.3f\n", layers, 1e3 * least, w.held, w.faces,
           w.crossings, w.left, w.exempt, 1e3 * w.gap, w.stretch);
    close_scene(&q);
    return w;
}

static void judge(seen w, int layers) {
    CHECK(w.miscounted == 0 && w.disorder == 0);
    CHECK(w.held >= 9 * layers && w.faces > 0);     /* those over the plates' middles */
    CHECK(w.stretch < 1.5);
    OPEN_MOST(w.failed, 0, "steps of a pinch that failed");
    if (!w.failed) CHECK(w.left == 0 && w.exempt == 0 && w.gap > 0.2 * T);
}

/* Plates that close to less than cloth has room for, to nothing, and that pass each other. */
static void closes(void) {
    judge(pinch(1, 1.5e-3, 20), 1);
    judge(pinch(1, 0.2e-3, 20), 1);
    judge(pinch(1, -4e-3, 20), 1);
}

/* A pinned vertex between the plates is the host's, not the pinch's; those around it are held, and
 * so is one that is pinned on an axis, across it: there it goes where the host says. */
static void pinned_is_not_caught(void) {
    static cloth_hold hold[MOST];
    const double      to[3] = {0, 0.4e-3, 0};
    scene             q;
    int               i, k, all, n = 0;
    for (all = 1; all >= 0; all--) {
        const unsigned axes = all ? CLOTH_AXIS_ALL : CLOTH_AXIS_Y;
        int            most = 0, held = 0;
        double         off = 0;
        open_scene(&q, 1, room_at(0, 3.2e-3), 1, NULL);
        CHECK(cloth_sim_pin(q.s.sim, 40, axes, all ? NULL : to) == CLOTH_OK);
        for (i = 1; i <= 24; i++) {
            plates_at(&q, room_at(i, 3.2e-3), 0);
            CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
            CHECK(cloth_step(q.s.sim, H, NULL) == CLOTH_OK);
            CHECK(cloth_collide_holds(q.s.c, MOST, hold, &n) == CLOTH_OK);
            for (k = 0; k < n; k++) held += hold[k].vertex == 40;
            most = n > most ? n : most;
            off = fmax(off, fabs(q.s.state->x[3 * 40 + 1] - (all ? 0 : to[1])));
        }
        CHECK(most >= 8 && (held == 0) == all);
        CHECK_NEAR(off, 0, 1e-12);
        close_scene(&q);
    }
}

/* Vertices that are held between one plate and the other. */
static int held_between(const scene *q) {
    static cloth_hold hold[MOST];
    int               n = 0, i, both = 0;
    CHECK(cloth_collide_holds(q->s.c, MOST, hold, &n) == CLOTH_OK && n <= MOST);
    for (i = 0; i < n; i++)
        both += (2 * hold[i].face[0] < q->body.nf) != (2 * hold[i].face[1] < q->body.nf);
    return both;
}

/* One step to the pose; the substeps that it took, 0: it failed. asked: desc.substeps. */
static int step_to(scene *q, double room, double side, int asked) {
    cloth_report r;
    plates_at(q, room, side);
    q->s.model->desc.substeps = asked;
    CHECK(cloth_collide_move(q->s.c, q->s.thing[q->id].id, q->s.thing[q->id].next) == CLOTH_OK);
    return cloth_step(q->s.sim, H, &r) == CLOTH_OK ? r.substeps : 0;
}

/* So many substeps that plates that hold cloth pass each other by 5 T in one at most, up to 4; the
 * same bits as where the caller asks for as many; and he has the last word. */
static void passing(void) {
    const size_t size = 3 * 81 * sizeof(double);
    double       room = 10e-3, side = 0;
    int          taken[5] = {0}, held, step, m;
    scene        q[3];
    for (step = 0; step < 3; step++) open_scene(q + step, 1, room, 1, NULL);
    for (step = 1; step < 50; step++) {
        const double next = room_at(step, -4e-3), aside = 0.04 * sin(0.4 * step);
        const double way = hypot(2 * (aside - side), next - room);
        held = held_between(q);
        m = held ? (int)fmin(fmax(ceil(way / (5 * T)), 1), 4) : 1;
        CHECK(step_to(q, next, aside, 0) == m);
        CHECK(step_to(q + 1, next, aside, m) == m);
        CHECK(memcmp(cloth_sim_state(q[0].s.sim)->x, cloth_sim_state(q[1].s.sim)->x, size) == 0);
        CHECK(step_to(q + 2, next, aside, 1) == 1);
        if (held) taken[m]++;
        room = next, side = aside;
    }
    printf("    steps with cloth that is held: %d of one substep, %d of 2, %d of 3, %d of 4\n",
           taken[1], taken[2], taken[3], taken[4]);
    for (m = 1; m <= 4; m++) CHECK(taken[m] > 0);
    for (step = 0; step < 3; step++) close_scene(q + step);
}

/* Two and three layers, which keep their order; once they did not where plates had passed. */
static void layers(void) {
    if (test_quick()) SKIP("long");
    judge(pinch(2, -3e-3, 30), 2);
    if (!test_full()) return;
    judge(pinch(2, 1e-3, 30), 2);
    judge(pinch(3, 0.5e-3, 30), 3);
}

/* Another body takes the place of the plates, thing `at`, or moves there and cloth takes a step. */
static int step_with(scene *q, const shape *body, int first, int *at) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    if (!first)
        return CHECK(cloth_collide_move(q->s.c, q->s.thing[*at].id, body->x) == CLOTH_OK) &&
               cloth_step(q->s.sim, H, NULL) == CLOTH_OK;
    CHECK(cloth_collide_remove(q->s.c, q->s.thing[q->id].id) == CLOTH_OK);
    d.nv = body->nv, d.x = body->x, d.nf = body->nf, d.faces = body->faces;
    d.self_penetrating = 1;
    *at = stage_add(&q->s, &d);
    return 1;
}

/* Vertices above or below the square of the plates that are farther than `most` m from y = 0. */
static int strayed(const scene *q, double most) {
    int i, n = 0;
    for (i = 0; i < q->s.mesh->nv; i++) {
        const double *p = q->s.state->x + 3 * i;
        n += fmax(fabs(p[0]), fabs(p[2])) < 0.06 && fabs(p[1]) > most;
    }
    return n;
}

/* A lip of the upper plate turns inside out, as a fold of a body does where joints bend: cloth that
 * is nearest to the back of it is caught between those faces that it is outside of. (A skirt in the
 * groin of a body that sits down was not, and all steps failed until that stood up; here it went
 * through the plate.) */
static void lip(void) {
    int   at = 0, k, held = 0, failed = 0;
    shape body = {0};
    scene q;
    open_scene(&q, 1, 10e-3, 1, NULL);
    for (k = 0; k <= 60 && !failed; k++) {
        const double room = room_at(k, 0.6e-3);
        body.nv = body.nf = 0;
        plate(&body, squares, 0.12, -0.5 * room - 0.01, 0.01);
        plate(&body, squares, 0.12, 0.5 * room, 0.01);
        plate(&body, squares, 0.12, 0.5 * room - 0.1e-3, k > 0 ? -0.1e-3 : 0.1e-3);
        failed = !step_with(&q, &body, k == 0, &at);
        held = (int)fmax(held, cloth_collide_last(q.s.c).held);
    }
    CHECK(!failed && held >= 9 && cloth_collide_last(q.s.c).held == 0);
    CHECK(strayed(&q, 5e-3) == 0);          /* between the plates, 10 mm apart */
    shape_free(&body);
    close_scene(&q);
}

/* Plates of 40 mm that overlap lift a sheet by 80 mm, farther than it gives way: it is more than 20
 * mm deep in the lower one then, nearest to what is beneath. It comes back between them. */
static void carried(void) {
    int   at = 0, i, k, deep = 0, failed = 0;
    shape body = {0};
    scene q;
    open_scene(&q, 1, 10e-3, 1, NULL);
    for (k = 0; k <= 90 && !failed; k++) {
        const double room = k <= 20 ? 10e-3 - k * 0.6e-3 : k < 70 ? -2e-3 : (k - 70) * 0.6e-3;
        const double up = 0.08 * fmax(0, fmin(1, fmin((k - 20) / 5.0, (70 - k) / 10.0)));
        body.nv = body.nf = 0;
        plate(&body, squares, 0.12, up - 0.5 * room - 0.04, 0.04);
        plate(&body, squares, 0.12, up + 0.5 * room, 0.04);
        failed = !step_with(&q, &body, k == 0, &at);
        for (i = 0; i < q.s.mesh->nv; i++) {
            const double *p = q.s.state->x + 3 * i;
            deep += fmax(fabs(p[0]), fabs(p[2])) < 0.06 && p[1] < up - 0.5 * room - 0.02;
        }
    }
    CHECK(!failed && deep > 0 && strayed(&q, 6e-3) == 0);
    shape_free(&body);
    close_scene(&q);
}

/* Without the flag the same is an obstacle like others: a pinch fails. */
static void without(void) {
    scene q;
    int   i, failed = 0;
    open_scene(&q, 1, 10e-3, 0, NULL);
    q.s.desc.hooks.log.fn = NULL;
    for (i = 1; i <= 30 && !failed; i++) {
        plates_at(&q, room_at(i, -1e-3), 0);
        (void)cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next);
        failed = cloth_step(q.s.sim, H, NULL) != CLOTH_OK;
        CHECK(cloth_collide_last(q.s.c).held == 0 && examine_holds(&q) == 0);
    }
    CHECK(failed);
    close_scene(&q);
}

/* A vertex 3 mm in a block of 3 cm: out by the near side; by the far one where it goes there by
 * itself; where the block leaves it, it stays as it goes, or goes out of another body there. */
static void way_out(void) {
    int turn, at, i, k;
    for (turn = 0; turn < 4; turn++) {
        const double lo[3] = {-0.3, -0.03, -0.3}, hi[3] = {0.3, -1e-3, 0.3};
        const double down[4] = {0, 0, 5e-3, 50e-3};
        const double by[3] = {0.01, turn == 1 ? -27e-3 : -5e-3, 0};
        const double out[4] = {-1e-3 + CLOTHI_GAP * T, -0.03 - CLOTHI_GAP * T, by[1],
                               -6e-3 - CLOTHI_GAP * T};
        cloth_obstacle_desc d = cloth_obstacle_desc_default();
        shape      block = {0};
        cloth_hold h;
        double     to[3] = {0, 0, 0};
        scene      q;
        memset(&h, 0, sizeof h);
        open_scene(&q, 1, 10e-3, 1, NULL);
        CHECK(cloth_collide_remove(q.s.c, q.s.thing[q.id].id) == CLOTH_OK);
        shape_box(&block, lo, hi);
        d.nv = block.nv, d.x = block.x, d.nf = block.nf, d.faces = block.faces;
        d.self_penetrating = 1;
        at = stage_add(&q.s, &d);
        h.slot = (int)(q.s.thing[at].id.id & 0xffffu) - 1;
        for (k = 0; k < block.nv; k++) block.x[3 * k + 1] -= down[turn];
        CHECK(cloth_collide_move(q.s.c, q.s.thing[at].id, block.x) == CLOTH_OK);
        if (turn == 3) {                    /* which comes from above to 1 mm below `by` */
            for (k = 0; k < block.nv; k++) block.x[3 * k + 1] += 0.5;
            at = stage_add(&q.s, &d);
            for (k = 0; k < block.nv; k++) block.x[3 * k + 1] -= 0.426;
            CHECK(cloth_collide_move(q.s.c, q.s.thing[at].id, block.x) == CLOTH_OK);
        }
        for (i = 0; i < q.half; i++) q.s.state->x[3 * i + 1] = -4e-3;
        clothi_world_pose(q.s.c, q.s.state->x, 0, 1);
        clothi_pinch_boxes(q.s.c);
        h.vertex = 40;
        for (k = 0; k < 2; k++) h.weight[k][0] = 1, h.face[k] = 2 * k;
        CHECK(clothi_hold_keep(q.s.c, by, &h, to) == (turn == 2 ? CLOTHI_PASSED : CLOTHI_OUT));
        CHECK_NEAR(to[0], by[0], 1e-9);
        CHECK_NEAR(to[1], out[turn], 1e-9);
        CHECK(h.slot == (int)(q.s.thing[at].id.id & 0xffffu) - 1);
        CHECK((h.face[1] == h.face[0] && h.weight[1][1] == h.weight[0][1]) == (turn == 3));
        shape_free(&block);
        close_scene(&q);
    }
}

/* --- what sweeps over held cloth --- */

/* Each of the closed plates goes its way, m, 3 cm a step at most, and turns; t from 0 to 1. */
static void sweep_to(scene *q, double way[2][4], double t) {
    double *x = q->s.thing[q->id].next;
    int     i, k;
    for (i = 0; i < q->body.nv; i++, x += 3) {
        const double *go = way[2 * i >= q->body.nv], a = t * go[3], x0 = x[0], x1 = x[1];
        x[0] = x0 * cos(a) - x1 * sin(a), x[1] = x0 * sin(a) + x1 * cos(a);
        for (k = 0; k < 3; k++) x[k] += t * go[k];
    }
}

/* Pairs of the cloth and the plates that did not intersect before this step, with faces of the
 * plates that are in no pinch. */
static int let_in(scene *q) {
    static int was[2 * 4096];
    stage      before = q->s;
    int        i, count = 0;
    if (before.npair) memcpy(was, before.pair, 2 * (size_t)before.npair * sizeof *was);
    before.pair = was;
    (void)stage_examine(&q->s);
    for (i = 0; i < q->s.npair; i++) {
        const int *p = q->s.pair + 2 * i;
        count += p[0] < q->s.mesh->nf && !stage_has(&before, p[0], p[1]) &&
                 !q->s.c->pinched[p[1]];
    }
    return count;
}

/* Nothing goes in but where a pinch is: faces fine beside the cloth's, so that cloth that is held
 * can be dragged to where none of them is near. */
static void sweeps(void) {
    const unsigned first = test_full() ? 1 : 11, last = test_full() ? 12 : 11;
    unsigned       seed;
    double         way[2][4];
    scene          q;
    int            i, in = 0, held = 0, steps = 0, early = 0;
    if (test_quick()) SKIP("long");
    squares = 24;
    for (seed = first; seed <= last; seed++) {
        unsigned long long draw = seed;
        const double       room = ref_uniform(&draw, -1e-3, 1e-3);
        for (i = 0; i < 8; i++)
            way[i / 4][i % 4] = ref_uniform(&draw, -1, 1) * (i % 4 == 3 ? 1 : 0.6);
        open_scene(&q, 1, room_at(0, 0), 1, NULL);
        q.s.desc.hooks.log.fn = NULL;
        for (i = 1; i <= 40; i++) {
            plates_at(&q, room_at(i < 20 ? i : 20, room), 0);
            sweep_to(&q, way, i <= 20 ? 0 : (i - 20) / 20.0);
            CHECK(!cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next));
            if (cloth_step(q.s.sim, H, NULL)) break;
            memcpy(q.s.thing[q.id].x, q.s.thing[q.id].next,
                   3 * (size_t)q.body.nv * sizeof(double));
            in += let_in(&q), steps++;
            held += cloth_collide_last(q.s.c).held > 0;
        }
        early += i <= 40;                   /* torn out of the plates faster than h allows     */
        close_scene(&q);
    }
    squares = 6;
    printf("    %d steps, %d of them with cloth that is held, %u ways, %d ended early: %d pairs "
           "let in outside of pinches\n", steps, held, last - first + 1, early, in);
    CHECK(in == 0 && 4 * held > steps);
}

/* --- the same bits --- */

static uint64_t hash_of(const double *a, int n) {
    uint64_t h = 0xcbf29ce484222325u, bits;
    for (; n > 0; n--, a++) {
        memcpy(&bits, a, sizeof bits);
        h = (h ^ bits) * 0x100000001b3u;
    }
    return h;
}

/* Parts that come no nearer than 2 t: the flag changes no bit. */
static void far_parts(void) {
    uint64_t hash[2] = {0, 1};
    int      flag, i;
    for (flag = 0; flag < 2; flag++) {
        scene q;
        open_scene(&q, 1, 10e-3, flag, NULL);
        for (i = 1; i <= 40; i++) {
            plates_at(&q, room_at(i, 2.2 * T), 0.02 * sin(0.2 * i));
            CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
            CHECK(cloth_step(q.s.sim, H, NULL) == CLOTH_OK);
            CHECK(cloth_collide_last(q.s.c).held == 0);
        }
        hash[flag] = hash_of(q.s.state->x, 3 * q.s.mesh->nv) +
                     7 * hash_of(q.s.state->v, 3 * q.s.mesh->nv);
        close_scene(&q);
    }
    CHECK(hash[0] == hash[1]);
}

/* Likewise beside the rims of plates that are turned against the cloth: what is nearest there is an
 * edge, of which either face may be found, and the room is asked along the normals of the faces. */
static void far_rims(void) {
    const double c = cos(0.37), s = sin(0.37);
    int          n, i, k, steps = 0;
    for (n = 3; n < 7; n++) {
        scene q;
        squares = n;
        open_scene(&q, 1, 10e-3, 1, NULL);
        for (i = 0; i < 30; i++) {
            double *x = q.s.thing[q.id].next;
            plates_at(&q, room_at(i, 2.2 * T), 0);
            for (k = 0; k < q.body.nv; k++, x += 3) {
                const double u = x[0] + 4.1e-3, w = x[2] + 2.3e-3;
                x[0] = c * u + s * w, x[2] = c * w - s * u;
            }
            if (i == 0) {
                memcpy(q.s.thing[q.id].x, q.s.thing[q.id].next,
                       3 * (size_t)q.body.nv * sizeof(double));
                CHECK(!cloth_collide_teleport(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].x));
            }
            CHECK(stage_step(&q.s, H));
            steps += cloth_collide_last(q.s.c).held > 0;
        }
        close_scene(&q);
    }
    squares = 6;
    OPEN_MOST(steps, 0, "steps of 120 that hold cloth beside rims which are 2.2 t apart");
}

static void go(scene *q, int from, int to) {
    for (; from <= to; from++) {
        plates_at(q, room_at(from, -1e-3), 0.001 * from);
        CHECK(cloth_collide_move(q->s.c, q->s.thing[q->id].id, q->s.thing[q->id].next) == CLOTH_OK);
        CHECK(cloth_step(q->s.sim, H, NULL) == CLOTH_OK);
    }
}

/* Saved in a pinch: restored there, in a sim that has not moved, and from the start again. */
static void snapshots(void) {
    scene    q, other;
    uint64_t middle, end;
    size_t   size;
    void    *buf;
    int      held;
    open_scene(&q, 1, 10e-3, 1, NULL);
    go(&q, 1, 22);
    held = cloth_collide_last(q.s.c).held;
    CHECK(held > 0);
    size = cloth_sim_save_size(q.s.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(q.s.sim, buf, size) == CLOTH_OK);
    middle = cloth_sim_hash(q.s.sim);
    go(&q, 23, 60);
    end = cloth_sim_hash(q.s.sim);
    CHECK(cloth_collide_last(q.s.c).held == 0);
    CHECK(cloth_sim_restore(q.s.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_hash(q.s.sim) == middle);
    CHECK(cloth_collide_last(q.s.c).held == held);
    go(&q, 23, 60);
    CHECK(cloth_sim_hash(q.s.sim) == end);
    CHECK(cloth_sim_reset(q.s.sim) == CLOTH_OK);
    go(&q, 1, 22);
    CHECK(cloth_sim_hash(q.s.sim) == middle);
    close_scene(&q);
    open_scene(&other, 1, 10e-3, 1, NULL);
    CHECK(cloth_sim_restore(other.s.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_hash(other.s.sim) == middle);
    go(&other, 23, 60);
    CHECK(cloth_sim_hash(other.s.sim) == end);
    close_scene(&other);
    open_scene(&other, 1, 10e-3, 0, NULL);  /* not flagged: other obstacles */
    other.s.desc.hooks.log.fn = NULL;
    CHECK(cloth_sim_restore(other.s.sim, buf, size) == CLOTH_ERR_FORMAT);
    close_scene(&other);
    free(buf);
}

/* Snapshots with the right checksum whose holds name what is not there: refused, the sim as before;
 * with what they were it takes them. */
static void forged(void) {
    static host  told;
    const int    bad[4] = {-1, 1 << 20, INT_MAX, INT_MIN};
    const double number[2] = {NAN, INFINITY};
    scene        q;
    uint64_t     was;
    size_t       size;
    void        *buf;
    int          i, k;
    open_scene(&q, 1, 10e-3, 1, NULL);
    go(&q, 1, 22);
    q.s.sim->hooks.log = host_hooks(&told).log;
    was = cloth_sim_hash(q.s.sim), size = cloth_sim_save_size(q.s.sim);
    buf = malloc(size);
    for (i = 0; i < 4; i++)
        for (k = 0; k < 8; k++) {
            cloth_hold *h = q.s.c->hold + (i ? q.s.c->nhold - 1 : 0), kept = *h;
            if (k < 4) *(k < 2 ? h->face + k : k < 3 ? &h->vertex : &h->slot) = bad[i];
            else *(k < 7 ? h->weight[i % 2] + k - 4 : &h->share) = number[i / 2];
            CHECK(buf && cloth_sim_save(q.s.sim, buf, size) == CLOTH_OK);
            *h = kept;
            host_forget(&told);
            CHECK(cloth_sim_restore(q.s.sim, buf, size) == CLOTH_ERR_FORMAT);
            CHECK(told.errors == 1 && strstr(told.text, "holds a vertex that is not there"));
            CHECK(cloth_sim_hash(q.s.sim) == was);
        }
    CHECK(cloth_sim_save(q.s.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(q.s.sim, buf, size) == CLOTH_OK && cloth_sim_hash(q.s.sim) == was);
    free(buf);
    close_scene(&q);
}

/* What goes away in a pinch leaves cloth that is free. */
static void removed(void) {
    scene q;
    int   i, n = -1;
    open_scene(&q, 1, 10e-3, 1, NULL);
    go(&q, 1, 25);
    CHECK(cloth_collide_last(q.s.c).held > 0);
    CHECK(cloth_collide_remove(q.s.c, q.s.thing[q.id].id) == CLOTH_OK);
    for (i = 0; i < 5; i++) CHECK(cloth_step(q.s.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_collide_holds(q.s.c, 0, NULL, &n) == CLOTH_OK && n == 0);
    CHECK(cloth_collide_last(q.s.c).held == 0);
    close_scene(&q);
}

/* Cloth that plates hold, and that refuses all else that intersects: a call between steps forgets
 * what is held, what it has let in stays exempt, and steps go on till the plates have opened. */
static void untangled(void) {
    cloth_untangle_report u;
    scene                 q;
    int                   i, n = -1;
    open_scene(&q, 1, 10e-3, 1, NULL);
    for (i = 1; i <= 60; i++) {
        plates_at(&q, room_at(i, 0.6e-3), 0);
        CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
        CHECK(cloth_step(q.s.sim, H, NULL) == CLOTH_OK);
        if (i != 20) continue;
        CHECK(cloth_collide_last(q.s.c).held > 0 && cloth_collide_last(q.s.c).exempt_pairs > 0);
        CHECK(cloth_collide_untangle(q.s.c, 0, &u) == CLOTH_OK && u.after > 0);
        CHECK(cloth_collide_holds(q.s.c, 0, NULL, &n) == CLOTH_OK && n == 0);
        CHECK(cloth_collide_last(q.s.c).held == 0);
        CHECK(cloth_collide_last(q.s.c).exempt_pairs == u.after);
    }
    CHECK(cloth_collide_last(q.s.c).held == 0 && cloth_collide_last(q.s.c).exempt_pairs == 0);
    close_scene(&q);
}

/* The same where a host has moved an edge of the cloth into a sphere besides: that is refused until
 * nothing intersects, in more calls than one. */
static void untangled_beside(void) {
    const double        centre[3] = {0.1, -0.035, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    scene               q;
    int                 i, failed = 0;
    open_scene(&q, 1, 10e-3, 1, NULL);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0.02, o.x = centre;
    CHECK(cloth_collide_add(q.s.c, &o, &id) == CLOTH_OK);
    for (i = 1; i <= 60; i++) {
        plates_at(&q, room_at(i, 0.6e-3), 0);
        CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
        if (i == 20) q.s.state->x[3 * 44 + 1] -= 0.02;
        while (cloth_step(q.s.sim, H, NULL) && CHECK(i == 20 && failed++ < 30))
            CHECK(cloth_collide_untangle(q.s.c, 0, NULL) == CLOTH_OK);
    }
    CHECK(failed > 1 && cloth_collide_last(q.s.c).exempt_pairs == 0);
    close_scene(&q);
}

/* The plates hold cloth, and open. A block that penetrates itself too, but that the cloth may not
 * touch, stands far off, or all around: held is as much, and nothing goes elsewhere. */
static void not_there(void) {
    double x[2][50][3 * 81], worst = 0;
    int    held[2][50], i, j, k, most = 0;
    for (k = 0; k < 2; k++) {
        const double        lo[3] = {-0.3, k ? -0.3 : 0.4, -0.3}, hi[3] = {0.3, 0.7, 0.3};
        cloth_obstacle_desc d = cloth_obstacle_desc_default();
        shape               block = {0, 0, NULL, NULL};
        cloth_obstacle      id;
        scene               q;
        open_scene(&q, 1, 10e-3, 1, NULL);
        shape_box(&block, lo, hi);
        d.nv = block.nv, d.x = block.x, d.nf = block.nf, d.faces = block.faces;
        d.self_penetrating = 1, d.category = d.mask = 2;
        CHECK(cloth_collide_add(q.s.c, &d, &id) == CLOTH_OK);
        for (i = 0; i < 50; i++) {
            go(&q, i + 1, i + 1);
            memcpy(x[k][i], q.s.state->x, sizeof x[k][i]);
            held[k][i] = cloth_collide_last(q.s.c).held;
        }
        shape_free(&block);
        close_scene(&q);
    }
    for (i = 0; i < 50; i++) {
        for (j = 0; j < 3 * 81; j++) worst = fmax(worst, fabs(x[0][i][j] - x[1][i][j]));
        most = held[0][i] > most ? held[0][i] : most;
        CHECK(held[0][i] == held[1][i]);
    }
    printf("  not there: differs by %.1e m\n", worst);
    CHECK(most > 0 && worst < 1e-6);        /* of rounding: trees have another shape */
}

static void workers(void) {
    uint64_t hash[2] = {0, 1};
    int      k;
    for (k = 0; k < 2; k++) {
        cloth_hooks  hooks;
        host_reverse two;
        scene        q;
        memset(&hooks, 0, sizeof hooks);
        if (k) host_turn_round(&hooks, &two, 2);
        open_scene(&q, 1, 10e-3, 1, &hooks);
        go(&q, 1, 35);
        hash[k] = cloth_sim_hash(q.s.sim);
        close_scene(&q);
    }
    CHECK(hash[0] == hash[1]);
}

/* The plates with all of their faces turned, closed still. Only pinches ask which side is solid:
 * without the flag such plates hold cloth as ever, closing to 3 mm and opening. With it all that is
 * free would be inside, and nothing ever be caught: to be refused by name. */
static void inside_out(void) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_status        status;
    scene               q;
    double              gap = 0;
    int                 i, new_pairs = 0;
    open_scene(&q, 1, 10e-3, 0, NULL);
    CHECK(cloth_collide_remove(q.s.c, q.s.thing[q.id].id) == CLOTH_OK);
    for (i = 0; i < q.body.nf; i++) {
        int *f = q.body.faces + 3 * i, corner = f[1];
        f[1] = f[2], f[2] = corner;
    }
    d.nv = q.body.nv, d.x = q.body.x, d.nf = q.body.nf, d.faces = q.body.faces;
    d.self_penetrating = 1;
    status = cloth_collide_add(q.s.c, &d, &id);
    CHECK(status == CLOTH_ERR_MESH);
    d.self_penetrating = 0;
    CHECK(cloth_collide_add(q.s.c, &d, &q.s.thing[q.id].id) == CLOTH_OK);
    for (i = 1; i <= 50; i++) {
        plates_at(&q, room_at(i, 3e-3), 0);
        CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
        CHECK(cloth_step(q.s.sim, H, NULL) == CLOTH_OK);
        memcpy(q.s.thing[q.id].x, q.s.thing[q.id].next, 3 * (size_t)q.body.nv * sizeof(double));
        new_pairs += stage_examine(&q.s);
    }
    CHECK(new_pairs == 0);
    CHECK(cloth_collide_gap(q.s.c, 0.01, &gap) == CLOTH_OK && gap > 0);
    close_scene(&q);
}

/* Contacts with a vertex that is held in a pinch are flagged, and no others: of two layers. */
static void held_contacts(void) {
    static cloth_collide_contact contact[4 * MOST];
    cloth_hold                   hold[MOST];
    scene                        q;
    int                          n = 0, count = 0, met[2] = {0, 0}, step, i, j, k;
    open_scene(&q, 2, 10e-3, 1, NULL);
    for (step = 1; step <= 12; step++) {
        plates_at(&q, room_at(step, 0), 0);
        CHECK(stage_step(&q.s, H));
        CHECK(cloth_collide_holds(q.s.c, MOST, hold, &n) == CLOTH_OK && n <= MOST);
        CHECK(cloth_collide_contacts(q.s.c, 4 * MOST, contact, &count) == CLOTH_OK);
        CHECK(count <= 4 * MOST);
        for (i = 0; i < count; i++) {
            int held = 0;
            for (j = 0; j < n; j++)
                for (k = 0; k < contact[i].n; k++) held |= hold[j].vertex == contact[i].vertex[k];
            CHECK(held == ((contact[i].flags & CLOTH_CONTACT_HELD) != 0));
            met[held]++;
        }
    }
    printf("  %d contacts of held vertices, %d of others\n", met[1], met[0]);
    CHECK(met[0] > 0 && met[1] > 0);
    close_scene(&q);
}

/* While cloth crosses the plates other obstacles come, leap and go, and a host writes x: what is
 * carried in the pinch is no reason to refuse them. What else crosses cloth is. */
static void beside(void) {
    const double        centre[3] = {0.4, 0, 0}, far[3] = {0.5, 0, 0}, in[3] = {0.09, 0, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_collide_pair  pair[MOST];
    cloth_obstacle      id, none;
    scene               q;
    int                 i, n;
    open_scene(&q, 1, 10e-3, 1, NULL);
    for (i = 1; i <= 25; i++) {
        plates_at(&q, room_at(i, -8e-3), 0);
        CHECK(stage_step(&q.s, H));
    }
    CHECK(cloth_collide_exempt(q.s.c, 0, NULL, &n) == CLOTH_OK && n > 0);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.radius = 0.02, o.x = centre;
    CHECK(cloth_collide_add(q.s.c, &o, &id) == CLOTH_OK);
    CHECK(cloth_collide_teleport(q.s.c, id, far) == CLOTH_OK);
    o.x = in;
    CHECK(cloth_collide_teleport(q.s.c, id, in) == CLOTH_ERR_MESH);
    CHECK(cloth_collide_failed(q.s.c, MOST, pair, &n) == CLOTH_OK && n > 0 && n < MOST);
    for (i = 0; i < n; i++) CHECK(pair[i].obstacle.id == id.id);
    CHECK(cloth_collide_add(q.s.c, &o, &none) == CLOTH_ERR_MESH);
    CHECK(cloth_collide_remove(q.s.c, id) == CLOTH_OK);
    CHECK(cloth_collide_failed(q.s.c, 0, NULL, &n) == CLOTH_OK && n == 0);
    ((cloth_state *)q.s.state)->x[0] += 1e-6;
    CHECK(stage_step(&q.s, H));
    CHECK(cloth_collide_last(q.s.c).held > 0);
    CHECK(cloth_collide_failed(q.s.c, 0, NULL, &n) == CLOTH_OK && n == 0);
    ((cloth_state *)q.s.state)->x[0] += 1e-6;
    o.x = centre;
    CHECK(cloth_collide_add(q.s.c, &o, &id) == CLOTH_OK);       /* holds are of another x then */
    CHECK(cloth_collide_holds(q.s.c, 0, NULL, &n) == CLOTH_OK && n == 0);
    CHECK(cloth_collide_last(q.s.c).held == 0);
    CHECK(stage_step(&q.s, H));
    close_scene(&q);
}

/* A square of two faces, its corner 0 between two plates. A rod of the same body is through the
 * edge from 1 to 3, of the face of 0: its ends are held too, to go out. */
static void threaded(void) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_mesh         *mesh;
    cloth_report        r;
    cloth_hold          hold[4];
    shape               body;
    stage               s;
    int                 i, n = 0, rod;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_DIAGONAL, 2, 2, 0.1, 0.1, &mesh)) exit(2);
    stage_cloth(&s, mesh);
    memset(s.desc.gravity, 0, sizeof s.desc.gravity);
    s.contact.thickness = T, s.contact.initial = CLOTH_INITIAL_EXEMPT;
    if (!stage_start(&s)) exit(2);
    memset(&body, 0, sizeof body);
    plate(&body, 2, 0.04, -0.0115, 0.01);
    plate(&body, 2, 0.04, 0.0015, 0.01);
    rod = body.nv;
    plate(&body, 1, 0.006, -0.01, 0.02);
    for (i = rod; i < body.nv; i++) body.x[3 * i] += 0.101, body.x[3 * i + 2] += 0.05;
    o.nv = body.nv, o.x = body.x, o.nf = body.nf, o.faces = body.faces, o.self_penetrating = 1;
    (void)stage_add(&s, &o);
    CHECK(cloth_step(s.sim, H, &r) == CLOTH_OK);
    CHECK(cloth_collide_holds(s.c, 4, hold, &n) == CLOTH_OK && n == 3);
    for (i = 0; i < n; i++) {               /* which goes out is of one face */
        CHECK(hold[i].vertex != 2);
        CHECK((hold[i].face[0] == hold[i].face[1]) == (hold[i].vertex > 0));
    }
    shape_free(&body);
    stage_end(&s);
}

/* A vertex without a face, between plates that close: no cloth hangs on it that could be dragged.
 * Nor is it held by what a snapshot says. */
static void faceless(void) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_mesh         *mesh;
    cloth_hold          h;
    shape               body;
    stage               s;
    double              mass[4] = {0.01, 0.01, 0.01, 0.01};         /* kg */
    size_t              size;
    void               *buf;
    int                 i, alone, held = 0;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_DIAGONAL, 2, 2, 0.1, 0.1, &mesh)) exit(2);
    alone = 6 - mesh->faces[0] - mesh->faces[1] - mesh->faces[2];
    for (i = 0; i < 4; i++) mesh->x[3 * i] += 0.5;
    for (i = 0; i < 3; i++) mesh->x[3 * alone + i] = 0;
    stage_cloth(&s, mesh);
    s.desc.nf = 1, s.desc.vertex_mass = mass, s.desc.gravity[1] = 0;
    s.contact.thickness = T;
    if (!stage_start(&s)) exit(2);
    plates(&body, 10e-3);
    o.nv = body.nv, o.x = body.x, o.nf = body.nf, o.faces = body.faces, o.self_penetrating = 1;
    CHECK(cloth_collide_add(s.c, &o, &s.thing[0].id) == CLOTH_OK);
    for (i = 1; i <= 25; i++) {
        shape_free(&body);
        plates(&body, room_at(i, 0.6e-3));
        CHECK(cloth_collide_move(s.c, s.thing[0].id, body.x) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        held += cloth_collide_last(s.c).held;
    }
    CHECK(held == 0);
    memset(&h, 0, sizeof h);
    h.vertex = alone;
    CHECK(CLOTHI_PUSH(s.c, hold, h) == CLOTH_OK);
    s.sim->hooks.log.fn = NULL;
    size = cloth_sim_save_size(s.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(s.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(s.sim, buf, size) == CLOTH_ERR_FORMAT);
    free(buf);
    shape_free(&body);
    stage_end(&s);
}

/* A rod thinner than the cloth's faces goes through one into a block of the same body, 3 mm below,
 * and out again, farther than it came from: no vertex need be in the pinch, and no step may fail.
 * What the rod is through stays on it. */
static void poked(void) {
    unsigned long long seed = 5;
    int                n, k, i, held = 0, failed = 0, cross = 0;
    for (n = test_full() ? 40 : test_quick() ? 4 : 8; n > 0; n--) {
        cloth_obstacle_desc o = cloth_obstacle_desc_default();
        shape               body;
        stage               s;
        int                 rod;
        double              at[2];
        for (k = 0; k < 2; k++) at[k] = ref_uniform(&seed, -0.08, 0.08);
        stage_sheet(&s, 5, 0.2);
        for (i = 0; i < 3 * s.nv; i++) s.x[i] -= i % 3 == 1 ? 0 : 0.1;
        s.contact.thickness = T;
        if (!stage_start(&s)) exit(2);
        memset(&body, 0, sizeof body);
        plate(&body, 8, 0.24, -0.043, 0.04);
        rod = body.nv;
        plate(&body, 2, 0.006, 0.003, 0.06);
        for (i = rod; i < body.nv; i++) body.x[3 * i] += at[0], body.x[3 * i + 2] += at[1];
        o.nv = body.nv, o.x = body.x, o.nf = body.nf, o.faces = body.faces, o.self_penetrating = 1;
        (void)stage_add(&s, &o);
        for (k = 0; k < 60; k++) {
            for (i = rod; i < body.nv && k < 30; i++)
                s.thing[0].next[3 * i + 1] += k < 12 ? -2e-3 : 2e-3;
            failed += !stage_step(&s, H);
            held = (int)fmax(held, cloth_collide_last(s.c).held);
        }
        CHECK(cloth_collide_intersections(s.c, 0, NULL, &i) == CLOTH_OK);
        cross += i;
        shape_free(&body);
        stage_end(&s);
    }
    printf("  poked: %d steps failed; %d vertices held at most; %d pairs 0.5 s after\n", failed,
           held, cross);
    CHECK(failed == 0 && held > 0);
    CHECK(cross == 0);                      /* pairs of sheets that the rod is through         */
}

/* Jaws of 40 mm close on a sheet that stands, to half of t, and open: what was crumpled into them
 * comes out by the side that it came in by. (It went on to the jaw's back where that was nearer,
 * and hung there, strained, for good.) */
static void close_jaws(unsigned long long seed) {
    const double        lo[3] = {-0.2, 0.06, -0.2}, hi[3] = {0.2, 0.1, 0.2};
    const double        low[3] = {-0.2, -0.1, -0.2}, high[3] = {0.2, -0.06, 0.2};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_mesh         *mesh = NULL;
    shape               body;
    stage               s;
    int                 k, i, failed = 0, most = 0, pairs;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 8, 8, 0.2, 0.2, &mesh)) exit(2);
    for (i = 0; i < mesh->nv; i++) {
        const double z = mesh->x[3 * i + 2] - 0.1;
        mesh->x[3 * i] -= 0.1, mesh->x[3 * i + 1] = 0.5 * z;
        mesh->x[3 * i + 2] = 0.3 * z + ref_uniform(&seed, 0, 0.004);
    }
    stage_cloth(&s, mesh);
    s.desc.material.membrane = 300, s.desc.material.bending = 1e-5, s.desc.material.density = 0.2;
    if (!stage_start(&s)) exit(2);
    memset(&body, 0, sizeof body);
    shape_box(&body, lo, hi);
    shape_box(&body, low, high);
    o.nv = body.nv, o.x = body.x, o.nf = body.nf, o.faces = body.faces, o.self_penetrating = 1;
    (void)stage_add(&s, &o);
    for (k = 1; k <= 100; k++) {
        const double way = k < 80 ? 0.0595 * (0.5 - 0.5 * cos(6.283185307179586 * k / 40)) : 0;
        for (i = 0; i < body.nv; i++)
            s.thing[0].next[3 * i + 1] = body.x[3 * i + 1] + (i < body.nv / 2 ? -way : way);
        failed += !stage_step(&s, H);
        most = (int)fmax(most, cloth_collide_last(s.c).held);
    }
    i = cloth_collide_last(s.c).held, pairs = cloth_collide_last(s.c).exempt_pairs;
    printf("  vise: %d steps failed; %d vertices held at most, %d and %d pairs when it is open\n",
           failed, most, i, pairs);
    CHECK(failed == 0 && most > 0 && i == 0 && pairs == 0);
    shape_free(&body);
    stage_end(&s);
}

static void vise(void) {
    close_jaws(3);
    close_jaws(6);
}

/* A smooth rod through a face is drawn along its axis: its sides push across that alone, and a free
 * sheet gains no momentum along it. */
static void drawn(void) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    shape  body = {0};
    stage  s;
    double mean = 0;
    int    i, k, held = 0, failed = 0;
    stage_sheet(&s, 5, 0.2);
    for (i = 0; i < s.nv; i++) s.x[3 * i] -= 0.11, s.x[3 * i + 2] -= 0.12;
    memset(s.desc.gravity, 0, sizeof s.desc.gravity);
    s.contact.thickness = T, s.contact.initial = CLOTH_INITIAL_EXEMPT;
    if (!stage_start(&s)) exit(2);
    plate(&body, 2, 0.006, -0.1, 0.2);
    o.nv = body.nv, o.x = body.x, o.nf = body.nf, o.faces = body.faces;
    o.self_penetrating = 1, o.friction = 0;
    (void)stage_add(&s, &o);
    for (k = 0; k < 4; k++) {
        for (i = 0; i < body.nv; i++) s.thing[0].next[3 * i + 1] += 0.02;
        failed += !stage_step(&s, H);
        held = (int)fmax(held, cloth_collide_last(s.c).held);
    }
    for (i = 0; i < s.mesh->nv; i++) mean += s.state->x[3 * i + 1] / s.mesh->nv;
    printf("  drawn: %d held, carried %.1e m of %.1e\n", held, mean, 4 * 0.02);
    CHECK(failed == 0 && held > 0);
    CHECK_NEAR(mean, 0, s.desc.tolerance);
    shape_free(&body);
    stage_end(&s);
}

/* Plates that hold a sheet without gravity go up and down: what they give it is booked as
 * contact's, and no energy comes from nowhere. */
static void booked(void) {
    static const int    corner[4] = {0, 8, 72, 80};
    static const double weightless[3] = {0, 0, 0};
    double              most = 0, nowhere = 0;
    int                 k, i, held = 0;
    scene               q;
    open_scene(&q, 1, 10e-3, 1, NULL);
    CHECK(cloth_sim_set_gravity(q.s.sim, weightless) == CLOTH_OK);
    for (k = 0; k < 4; k++) CHECK(cloth_sim_unpin(q.s.sim, corner[k]) == CLOTH_OK);
    for (k = 1; k <= 60; k++) {
        cloth_report r;
        plates_at(&q, room_at(k < 20 ? k : 20, 1.5e-3), 0);
        for (i = 0; i < q.body.nv; i++)
            q.s.thing[q.id].next[3 * i + 1] += k > 20 ? 0.02 * sin(0.5 * (k - 20)) : 0;
        CHECK(cloth_collide_move(q.s.c, q.s.thing[q.id].id, q.s.thing[q.id].next) == CLOTH_OK);
        CHECK(cloth_step(q.s.sim, H, &r) == CLOTH_OK);
        held = (int)fmax(held, cloth_collide_last(q.s.c).held);
        nowhere = fmax(nowhere, -r.energy.numerical_loss);
        most = fmax(most, r.energy.total);
    }
    printf("    %d held, %.1e J at most, in a step %.1e from nowhere\n", held, most, nowhere);
    CHECK(held >= 9 && nowhere < 1e-3 * most);
    close_scene(&q);
}

/* --- backwards: where cloth is pulled to moves with the body and with x^n --- */

/* `to` of a hold, at the poses that the collide has: `y` is where it would go by itself. */
static void pulled_to(const cloth_collide *c, const cloth_hold *h, const double *y, double *to) {
    const unsigned char look = c->look[h->vertex];
    const cloth_hold   *by = look == CLOTHI_ASIDE ? c->caught + h->vertex : h;
    double              A[3], B[3], n[3], d = 0;
    int                 k;
    if (look == CLOTHI_LED) memcpy(to, c->xa + 3 * h->vertex, 3 * sizeof *to);
    else if (look < CLOTHI_OUT) clothi_hold_goal(c, h, to);
    else memcpy(to, y, 3 * sizeof *to);
    if (look == CLOTHI_HELD || look == CLOTHI_BACK || look == CLOTHI_PASSED) return;
    clothi_hold_point(c, by, 0, c->xa, A, n);
    clothi_hold_point(c, by, 0, c->xb, B, n);
    for (k = 0; k < 3; k++) d += n[k] * (B[k] - (look == CLOTHI_LED ? A : to)[k]);
    for (k = 0; k < 3; k++) to[k] += (d + (look == CLOTHI_LED ? 1 : CLOTHI_GAP) * T) * n[k];
}

/* Both plates at both poses, and the held vertex at x^n, go eps along `way`: what the walk
 * backwards says of a . (force of the pull) is its difference. */
static double pull_rates(scene *q, const cloth_hold *h, const double *way, const double *a) {
    const double    eps = 1e-7;
    cloth_collide  *c = q->s.c;
    clothi_adjoint  got;
    double         *flow[4], start[3], to[3], y[3], hess[9], worst = 0, size;
    clothi_flow     f;
    int             i, k, part, n = c->nw - c->nv;
    memset(&got, 0, sizeof got);
    for (k = 0; k < 4; k++) flow[k] = (double *)calloc(3 * (size_t)c->nw, sizeof(double));
    got.world[0] = flow[0], got.world[1] = flow[1];
    f.c = c, f.to = &got, f.whole = 1, f.a = a, f.cloth[0] = flow[2], f.cloth[1] = flow[3];
    clothi_back_hold(&f, h);
    (void)clothi_hold_pull(c, h, c->xb + 3 * h->vertex, start, hess);
    size = hess[0] + hess[4] + hess[8];
    memcpy(y, c->hold_to + 3 * h->vertex, sizeof y);
    pulled_to(c, h, y, start);
    for (k = 0; k < 3; k++)                 /* there it was pulled in the step */
        if (!(fabs(start[k] - y[k]) < 1e-12)) worst = HUGE_VAL;
    for (part = 0; part < 5; part++) {      /* plate 0, 1 at the start, at the end; the vertex */
        double *x = part < 2 ? c->xa : c->xb, said = 0, is = 0;
        int     first = c->nv + part % 2 * n / 2, end = first + n / 2;
        if (part == 4) x = c->xa, first = h->vertex, end = first + 1;
        for (i = first; i < end; i++)
            for (k = 0; k < 3; k++) {
                x[3 * i + k] += eps * way[k];
                said += way[k] * (part == 4 ? flow[2] : flow[part / 2] - 3 * c->nv)[3 * i + k];
            }
        for (k = 0; k < 3 && part == 4; k++) y[k] += eps * way[k];
        pulled_to(c, h, y, to);
        for (i = 0; i < 9; i++)             /* of the force, -hess dto */
            is -= a[3 * h->vertex + i / 3] * hess[i] * (to[i % 3] - start[i % 3]) / eps;
        for (i = first; i < end; i++)
            for (k = 0; k < 3; k++) x[3 * i + k] -= eps * way[k];
        if (!(fabs(said - is) <= worst * size)) worst = fabs(said - is) / size;
        if (!(worst < 1e9)) break;          /* NaN stays */
    }
    for (k = 0; k < 4; k++) free(flow[k]);
    return worst;
}

/* The same where the held vertex alone goes, at the substep's end. */
static double pull_by_x(const scene *q, const cloth_hold *h, const double *way, const double *a) {
    const double   eps = 1e-7;
    cloth_collide *c = q->s.c;
    const int      at = 3 * h->vertex;
    double        *flow = (double *)calloc(3 * (size_t)c->nv, sizeof *flow);
    double         x[3], grad[2][3], hess[9], said = 0, is = 0;
    clothi_adjoint none;
    clothi_flow    f;
    int            i, k;
    memset(&none, 0, sizeof none);
    f.c = c, f.to = &none, f.whole = 0, f.a = a, f.cloth[0] = NULL, f.cloth[1] = flow;
    clothi_back_hold(&f, h);
    for (i = 0; i < 2; i++) {
        for (k = 0; k < 3; k++) x[k] = c->xb[at + k] + (i ? eps : -eps) * way[k];
        (void)clothi_hold_pull(c, h, x, grad[i], hess);
    }
    for (k = 0; k < 3; k++) {
        said += way[k] * flow[at + k];
        is += a[at + k] * (grad[1][k] - grad[0][k]) / (2 * eps);
    }
    free(flow);
    if ((clothi_max_abs(grad[0], 3) > 0) != (clothi_max_abs(grad[1], 3) > 0)) return 0;
    said = fabs(said - is);                 /* 0 where what is led has gone out by itself      */
    return said > 0 ? said / (hess[0] + hess[4] + hess[8]) : 0;
}

static void backwards(void) {
    unsigned long long seed = 3;
    double             worst = 0, rate;
    int                looks[7] = {0}, wrong = 0, turn, step, i, k;
    for (turn = 0; turn < (test_full() ? 6 : 3); turn++) {
        const double fast = ref_uniform(&seed, 0.2e-3, 3e-3);
        scene        q;
        size_t       size;
        double      *a;
        open_scene(&q, 1, 10e-3, 1, NULL);
        q.s.model->desc.substeps = 1;       /* which begins where the step does */
        size = 3 * (size_t)q.s.c->nw * sizeof(double);
        a = (double *)malloc(size);
        for (step = 0; step < 50; step++) {
            memcpy(a, q.s.c->xb, size);
            plates_at(&q, room_at(step, -8e-3), fast * (step % 20 - 10));
            if (!stage_step(&q.s, H)) continue;
            memcpy(q.s.c->xa, a, size);     /* as it was when the step began */
            for (i = 0; i < 3 * q.s.mesh->nv; i++) a[i] = ref_uniform(&seed, -1, 1);
            for (i = 0; i < q.s.c->nhold; i++) {
                const cloth_hold *h = q.s.c->hold + i;
                double            way[3];
                for (k = 0; k < 3; k++) way[k] = ref_uniform(&seed, -1, 1);
                looks[q.s.c->look[h->vertex]]++;
                rate = pull_rates(&q, h, way, a);
                wrong += !(rate < 1e-6) + !(pull_by_x(&q, h, way, a) < 1e-6);
                worst = fmax(worst, rate);
            }
        }
        free(a);
        close_scene(&q);
    }
    printf("  backwards: %d held, %d aside, %d led, %d back, %d out, %d passed; worst %.1e\n",
           looks[CLOTHI_HELD], looks[CLOTHI_ASIDE], looks[CLOTHI_LED], looks[CLOTHI_BACK],
           looks[CLOTHI_OUT], looks[CLOTHI_PASSED], worst);
    for (i = CLOTHI_HELD; i <= CLOTHI_PASSED; i++) CHECK(looks[i] > 0);
    CHECK(wrong == 0);
}

static void refusals(void) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_hold          hold[2];
    scene               q;
    stage               s;
    int                 n = 7;
    open_scene(&q, 1, 10e-3, 1, NULL);
    q.s.desc.hooks.log.fn = NULL;
    CHECK(cloth_collide_holds(NULL, 2, hold, &n) == CLOTH_ERR_ARGUMENT && n == 7);
    CHECK(cloth_collide_holds(q.s.c, -1, hold, &n) == CLOTH_ERR_ARGUMENT && n == 7);
    CHECK(cloth_collide_holds(q.s.c, 2, NULL, &n) == CLOTH_ERR_ARGUMENT && n == 7);
    CHECK(cloth_collide_holds(q.s.c, 2, hold, NULL) == CLOTH_OK);
    stage_sheet(&s, 5, 0.2);                /* by leapfrog nothing pulls what is held */
    s.desc.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    if (!stage_start(&s)) exit(2);
    o.nv = q.body.nv, o.x = q.body.x, o.nf = q.body.nf, o.faces = q.body.faces;
    for (o.self_penetrating = 1; o.self_penetrating >= 0; o.self_penetrating--)
        CHECK(cloth_collide_add(s.c, &o, &id) ==
              (o.self_penetrating ? CLOTH_ERR_UNSUPPORTED : CLOTH_OK));
    stage_end(&s);
    close_scene(&q);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(closes);
    RUN(pinned_is_not_caught);
    RUN(passing);
    RUN(layers);
    RUN(lip);
    RUN(carried);
    RUN(without);
    RUN(way_out);
    RUN(sweeps);
    RUN(far_parts);
    RUN(far_rims);
    RUN(snapshots);
    RUN(forged);
    RUN(removed);
    RUN(untangled);
    RUN(untangled_beside);
    RUN(not_there);
    RUN(workers);
    RUN(inside_out);
    RUN(held_contacts);
    RUN(beside);
    RUN(threaded);
    RUN(faceless);
    RUN(poked);
    RUN(drawn);
    RUN(booked);
    RUN(vise);
    RUN(backwards);
    RUN(refusals);
    return TEST_END();
}
