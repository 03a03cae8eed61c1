/* test_queries.c - what contact tells of a step against what is measured from outside: gaps, pairs,
 * exempt ones, numbers in obstacles' meshes, bytes, and whose snapshot it is.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_queries.c -lm
 * tier: quick */
#include "../clothsim_collide.h"

#include "test.h"
#include "collide_world.h"
#include "shapes.h"

enum { MOST = 400 };

static host  H;
static world W;
static cloth_collide_contact T[MOST];

/* The world far from the origin: a distance that holds a position would show. */
static const double FAR[3] = {40, -30, 7};
static int          cut;                    /* steps end after one iteration of Newton's       */

static void open_far(cloth_integrator integrator, int ball) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_desc          d = cloth_desc_default();
    double              at[3];
    int                 i;
    memset(&W, 0, sizeof W);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 6, 6, 0.2, 0.2, &W.mesh)) exit(2);
    for (i = 0; i < 3 * W.mesh->nv; i++) W.mesh->x[i] += FAR[i % 3];
    d.nv = W.mesh->nv, d.x_rest = W.mesh->x, d.nf = W.mesh->nf, d.faces = W.mesh->faces;
    d.material.membrane = 300;
    d.material.density = 0.2;
    d.integrator = integrator;
    d.max_newton = cut;
    d.contact = CLOTH_CONTACT_SELF;
    CHECK(cloth_model_create(&d, &W.model) == CLOTH_OK);
    CHECK(cloth_sim_create(W.model, &W.sim) == CLOTH_OK);
    CHECK(cloth_collide_create(W.sim, NULL, &W.c) == CLOTH_OK);
    memcpy(at, FAR, sizeof at);
    o.kind = ball ? CLOTH_OBSTACLE_SPHERE : CLOTH_OBSTACLE_PLANE;
    o.radius = ball ? 0.05 : 0;
    at[0] += ball ? 0.11 : 0;
    at[2] += ball ? 0.09 : 0;
    at[1] -= ball ? 0.08 : 0.03;
    o.normal[1] = 1e200;                    /* any length */
    o.x = at;
    CHECK(cloth_collide_add(W.c, &o, &W.ball) == CLOTH_OK);
}

/* Distance of a cloth vertex from the plane, or of the contact's point from the sphere's centre. */
static double measured(const double *x, const cloth_collide_contact *q, int ball) {
    double p[3] = {0, 0, 0}, centre[3], sum = 0;
    int    i, k;
    for (i = 0; i < q->n; i++) sum += q->weight[i];
    for (i = 0; i < q->n; i++)
        for (k = 0; k < 3; k++) p[k] += q->weight[i] / sum * x[3 * q->vertex[i] + k];
    centre[0] = FAR[0] + 0.11, centre[1] = FAR[1] - 0.08, centre[2] = FAR[2] + 0.09;
    if (!ball) return p[1] - (FAR[1] - 0.03);
    for (k = 0; k < 3; k++) p[k] -= centre[k];
    return sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 0.05;
}

/* The record is of the end of the step: gap, points and forces; a row's frame is of the impact. */
static void record(const cloth_collide_contact *q, const double *x, int ball, int row) {
    const double d = measured(x, q, ball), size = sqrt(q->normal[0] * q->normal[0] +
                                                       q->normal[1] * q->normal[1] +
                                                       q->normal[2] * q->normal[2]);
    double sum = 0, apart = 0, off = 0, rub = 0, p[3] = {0, 0, 0};
    int    i, k, side;
    CHECK_NEAR(size, 1, 1e-12);
    CHECK((row != 0) == ((q->flags & CLOTH_CONTACT_ROW) != 0));
    CHECK(q->force > 0 && (q->flags & CLOTH_CONTACT_HELD) == 0);
    CHECK(((q->flags & CLOTH_CONTACT_INEXACT) != 0) == cut);
    for (i = 0; i < q->n; i++) {
        sum += q->weight[i];
        for (k = 0; k < 3; k++) p[k] += q->weight[i] * x[3 * q->vertex[i] + k];
    }
    CHECK_NEAR(fabs(sum), 1, 1e-12);
    side = sum < 0;
    for (k = 0; k < 3; k++) {
        apart += (q->point[0][k] - q->point[1][k]) * q->normal[k];
        off = fmax(off, fabs(q->point[side][k] - p[k] / sum));
        rub += q->friction[k] * q->friction[k];
    }
    CHECK_NEAR(off, 0, 1e-13);
    CHECK_NEAR(apart, q->gap, 1e-13);
    CHECK(sqrt(rub) <= q->limit * (1 + 1e-12));
    CHECK(((q->flags & CLOTH_CONTACT_SLIDING) != 0) == (sqrt(rub) > q->limit * (1 - 1e-9)));
    if (row) CHECK(q->gap > 0 && q->gap <= d + 1e-13);
    else CHECK_NEAR(q->gap, d, 1e-13);
}

static void gaps(void) {
    const cloth_integrator kind[2] = {CLOTH_INTEGRATOR_EULER, CLOTH_INTEGRATOR_LEAPFROG};
    int                    k, ball, step, i, count, seen;
    for (k = 0; k < 2; k++)
        for (ball = 0; ball < 2; ball++) {
            const double h = k ? 1.0 / 2000 : 1.0 / 100;
            double       worst = 0;
            cloth_report r;
            open_far(kind[k], ball);
            for (step = seen = 0; step < (k ? 400 : 40); step++) {
                double now;
                CHECK(cloth_step(W.sim, h, &r) == CLOTH_OK);
                CHECK(cloth_collide_contacts(W.c, MOST, T, &count) == CLOTH_OK && count < MOST);
                CHECK(r.contacts == count);
                for (i = 0; i < count; i++)
                    if (T[i].pair.obstacle.id == W.ball.id)     /* not cloth on cloth */
                        record(T + i, cloth_sim_state(W.sim)->x, ball, k);
                CHECK(cloth_collide_gap(W.c, 2e-3, &now) == CLOTH_OK);
                if (count == 0) continue;
                seen++;
                CHECK(r.smallest_gap < 2e-3 && r.smallest_gap >= now);
                worst = fmax(worst, fabs(r.smallest_gap - now));
            }
            printf("  %s on a %s: %d steps in contact, smallest_gap off by %.1e m\n",
                   k ? "LEAPFROG" : "EULER", ball ? "sphere" : "plane", seen, worst);
            CHECK(seen > 5);
            if (!k) CHECK(worst < 1e-13);
            world_close(&W);
        }
}

/* What a step leaves that is cut short is flagged as such, and nothing else of it differs. */
static void inexact(void) {
    cloth_report r;
    int          step, i, count = 0, seen = 0;
    cut = 1;
    open_far(CLOTH_INTEGRATOR_EULER, 0);
    for (step = 0; step < 20; step++) {
        CHECK(cloth_step(W.sim, 1.0 / 100, &r) == CLOTH_OK);
        CHECK(cloth_collide_contacts(W.c, MOST, T, &count) == CLOTH_OK && count < MOST);
        if (r.outcome != CLOTH_STEP_MAX_ITERATIONS) continue;
        for (i = 0; i < count; i++) record(T + i, cloth_sim_state(W.sim)->x, 0, 0);
        seen += count > 0;
    }
    CHECK(seen > 2);
    world_close(&W);
    cut = 0;
}

/* Where nothing is near the smallest gap is the thickness from which something would be felt. */
static void nothing_near(void) {
    static const double far[3] = {0, -5, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_report        r;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-4, &r) == CLOTH_OK);
    CHECK_NEAR(r.smallest_gap, 2e-3, 0);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = far, o.radius = 0.1, o.thickness = 7e-3;
    CHECK(cloth_collide_add(W.c, &o, NULL) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1e-4, &r) == CLOTH_OK && r.contacts == 0);
    CHECK_NEAR(r.smallest_gap, 7e-3, 0);
    world_close(&W);
}

/* A pinch between two boxes: vertices, edges and faces count in each box's own mesh, also after a
 * third was refused that would have come before them. */
static void numbers(void) {
    cloth_collide_pair  pair[MOST];
    cloth_report        r;
    double              x[24], center[3] = {0.1, -0.052, 0.1}, half[3] = {0.2, 0.05, 0.2};
    double              far[3] = {5, 5, 5}, through[3] = {0.1, 0, 0.1};
    cloth_obstacle      high, first;
    int                 i, count = 0, edges = 0, reversed = 0;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    CHECK(world_box(&W, far, half, &first) == CLOTH_OK);
    CHECK(world_box(&W, center, half, NULL) == CLOTH_OK);
    center[1] = 0.06;
    half[0] = 0.05;                         /* its edges over the sheet */
    CHECK(world_box(&W, center, half, &high) == CLOTH_OK);
    CHECK(cloth_collide_remove(W.c, first) == CLOTH_OK);
    CHECK(world_box(&W, through, half, NULL) == CLOTH_ERR_MESH);
    center[1] = 0.0485;
    cloth_obstacle_box(center, half, NULL, x);
    CHECK(cloth_collide_move(W.c, high, x) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_ERR_STEP);
    CHECK(cloth_collide_failed(W.c, MOST, pair, &count) == CLOTH_OK && count > 0);
    for (i = 0; i < count && i < MOST; i++) {
        const cloth_collide_pair *p = pair + i;
        const int box = p->reversed ? p->a : p->b, cloth = p->reversed ? p->b : p->a;
        CHECK(p->obstacle.id != 0 && !p->faces);
        CHECK(box >= 0 && box < (p->edge_edge ? 18 : p->reversed ? 8 : 12));
        CHECK(cloth >= 0 && cloth < (p->edge_edge ? 161 + 48 : p->reversed ? W.mesh->nf
                                                                           : W.mesh->nv));
        edges += p->edge_edge;
        reversed += p->reversed;
    }
    printf("  %d pairs, %d of edges, %d with the obstacle's first\n", count, edges, reversed);
    CHECK(edges > 0);
    world_close(&W);
}

/* A ball through the sheet: its exempt pairs are listed, counted and gone when it has left. */
static void exempt(void) {
    cloth_collide_desc d = cloth_collide_desc_default();
    cloth_collide_pair pair[MOST];
    cloth_report       r;
    double             through[3] = {0.1, 0, 0.1}, above[3] = {0.1, 0.3, 0.1};
    size_t             size;
    void              *buf;
    int                i, count = 0, near = 0, listed = 0;
    d.initial = CLOTH_INITIAL_EXEMPT;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, &d) == CLOTH_OK);
    CHECK(cloth_collide_exempt(W.c, MOST, pair, &count) == CLOTH_OK && count == 0);
    CHECK(cloth_collide_teleport(W.c, W.ball, through) == CLOTH_OK);
    CHECK(cloth_collide_exempt(W.c, MOST, pair, &count) == CLOTH_OK && count > 0);
    CHECK(cloth_collide_last(W.c).exempt_pairs == count && count <= MOST);
    for (i = 0; i < W.mesh->nv; i++) {      /* each vertex inside it is in a listed face */
        const double *p = cloth_sim_state(W.sim)->x + 3 * i;
        int           j, hit = 0, k;
        if (!(hypot(hypot(p[0] - 0.1, p[1]), p[2] - 0.1) < 0.06)) continue;
        near++;
        for (j = 0; j < count; j++) {
            CHECK(pair[j].obstacle.id == W.ball.id && !pair[j].faces && pair[j].reversed);
            for (k = 0; k < 3; k++) hit |= W.mesh->faces[3 * pair[j].b + k] == i;
        }
        listed += hit;
    }
    printf("  %d pairs, %d of %d vertices inside are in them\n", count, listed, near);
    CHECK(near > 3 && listed == near);
    CHECK(cloth_collide_exempt(W.c, 2, pair, &i) == CLOTH_OK && i == count);
    size = cloth_sim_save_size(W.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_collide_last(W.c).exempt_pairs == count);
    free(buf);
    CHECK(cloth_collide_exempt(W.c, -1, pair, &i) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_exempt(NULL, 2, pair, &i) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_collide_move(W.c, W.ball, above) == CLOTH_OK);
    for (i = 0; i < 3; i++) CHECK(cloth_step(W.sim, 1e-3, &r) == CLOTH_OK);
    CHECK(cloth_collide_exempt(W.c, MOST, pair, &count) == CLOTH_OK && count == 0);
    world_close(&W);
}

/* After reset and restore there is no last step to ask about. */
static void forgotten(void) {
    void  *buf;
    size_t size;
    int    count = 0, which;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    size = cloth_sim_save_size(W.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    for (which = 0; which < 2; which++) {
        CHECK(world_run(&W, 16, 1.0 / 60));
        CHECK(cloth_collide_contacts(W.c, 0, NULL, &count) == CLOTH_OK && count > 0);
        CHECK((which ? cloth_sim_restore(W.sim, buf, size) : cloth_sim_reset(W.sim)) == CLOTH_OK);
        CHECK(cloth_collide_contacts(W.c, 0, NULL, &count) == CLOTH_OK && count == 0);
        CHECK(cloth_collide_last(W.c).contacts == 0 && cloth_collide_last(W.c).candidates == 0);
    }
    free(buf);
    world_close(&W);
}

/* A snapshot belongs to obstacles of its kinds, shapes and places, and to one desc; their friction
 * is in it. */
static void whose_snapshot(void) {
    static const double center[3] = {0.1, -0.08, 0.1};
    cloth_collide_desc  desc = cloth_collide_desc_default();
    cloth_hooks         hooks = host_hooks(&H);
    size_t              size;
    uint64_t            before;
    void               *buf;
    int                 which;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, NULL, NULL) == CLOTH_OK);
    size = cloth_sim_save_size(W.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    world_close(&W);
    for (which = 0; which < 6; which++) {
        cloth_obstacle_desc o = cloth_obstacle_desc_default();
        desc = cloth_collide_desc_default();
        if (which == 1) desc.thickness *= 2;
        if (which == 2) desc.friction *= 2;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, &desc) == CLOTH_OK);
        o.kind = which == 3 ? CLOTH_OBSTACLE_PLANE : CLOTH_OBSTACLE_SPHERE;
        o.x = center;
        o.normal[1] = 1;
        o.radius = which == 4 ? 0.05 : 0.06;
        o.friction = which == 5 ? 0.2 : 0.1;
        if (which > 2) {
            CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
            CHECK(cloth_collide_add(W.c, &o, &W.ball) == CLOTH_OK);
        }
        before = cloth_sim_hash(W.sim);
        CHECK(cloth_sim_restore(W.sim, buf, size) ==
              (which && which < 5 ? CLOTH_ERR_FORMAT : CLOTH_OK));
        CHECK((cloth_sim_hash(W.sim) == before) == (which < 5));
        if (which && which < 5) CHECK(strstr(H.text, "collide: the snapshot has other obstacles"));
        world_close(&W);
        host_forget(&H);
    }
    free(buf);
}

/* An editor takes back the removal of an obstacle, and a saved game meets obstacles that came and
 * went in another order: what counts is that they are the same in the same slots. */
static void removal_taken_back(void) {
    static const double center[3] = {0.1, -0.08, 0.1};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      old;
    uint64_t            saved, end;
    size_t              size;
    void               *buf;
    double              force[3], torque[3];
    CHECK(world_open(&W, CLOTH_INTEGRATOR_BDF2, NULL, NULL) == CLOTH_OK);
    CHECK(world_run(&W, 14, 1.0 / 60));
    size = cloth_sim_save_size(W.sim), saved = cloth_sim_hash(W.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
    CHECK(world_run(&W, 4, 1.0 / 60));
    end = cloth_sim_hash(W.sim), old = W.ball;
    CHECK(cloth_collide_remove(W.c, W.ball) == CLOTH_OK);
    CHECK(cloth_step(W.sim, 1.0 / 60, NULL) == CLOTH_OK);
    CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_ERR_FORMAT);
    CHECK(cloth_sim_reset(W.sim) == CLOTH_OK);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = center, o.radius = 0.06, o.friction = 0.1;
    CHECK(cloth_collide_add(W.c, &o, &W.ball) == CLOTH_OK && W.ball.id != old.id);
    CHECK(cloth_sim_restore(W.sim, buf, size) == CLOTH_OK && cloth_sim_hash(W.sim) == saved);
    CHECK(world_run(&W, 4, 1.0 / 60) && cloth_sim_hash(W.sim) == end);
    CHECK(cloth_collide_wrench(W.c, W.ball, NULL, force, torque) == CLOTH_OK && force[1] < 0);
    CHECK(cloth_collide_wrench(W.c, old, NULL, force, torque) == CLOTH_ERR_HANDLE);
    free(buf);
    world_close(&W);
}

/* A snapshot belongs to parts of one word on whom they meet: each of these decides contacts. */
static void whose_parts(void) {
    cloth_hooks        hooks = host_hooks(&H);
    cloth_collide_desc desc = cloth_collide_desc_default();
    cloth_collide_part part;
    size_t             size = 0;
    void              *buf = NULL;
    int                which;
    for (which = 0; which < 6; which++) {   /* saved, the same, then one thing is another */
        memset(&part, 0, sizeof part);
        part.self = which != 2;
        part.category = which == 3 ? 3 : 1, part.mask = which == 4 ? 0xff : 0xffffffffu;
        part.friction = which == 5 ? 0.2 : 0;
        desc.nparts = 1, desc.parts = &part;
        CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, &desc) == CLOTH_OK);
        if (which == 0) {
            size = cloth_sim_save_size(W.sim);
            buf = malloc(size);
            CHECK(buf && cloth_sim_save(W.sim, buf, size) == CLOTH_OK);
        } else
            CHECK(cloth_sim_restore(W.sim, buf, size) == (which > 1 ? CLOTH_ERR_FORMAT : CLOTH_OK));
        world_close(&W);
        host_forget(&H);
    }
    free(buf);
}

/* report.bytes.contact is what destroy gives back, and part of the total, all that the allocator
 * has given out; a body that may penetrate itself included. */
static void bytes(void) {
    static const double far[3] = {0, -3, 0};
    cloth_hooks         hooks = host_hooks(&H);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    shape               body = {0, 0, NULL, NULL};
    cloth_report        r;
    size_t              owned;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    shape_sphere(&body, far, 0.1, 12);
    o.kind = CLOTH_OBSTACLE_MESH;
    o.nv = body.nv, o.x = body.x, o.nf = body.nf, o.faces = body.faces;
    o.self_penetrating = 1;
    CHECK(cloth_collide_add(W.c, &o, NULL) == CLOTH_OK);
    shape_free(&body);
    CHECK(world_run(&W, 20, 1.0 / 60));
    CHECK(cloth_step(W.sim, 1.0 / 60, &r) == CLOTH_OK);
    CHECK(r.bytes.total == H.bytes);
    owned = H.bytes;
    cloth_collide_destroy(W.c);
    W.c = NULL;
    owned -= H.bytes;
    CHECK(r.bytes.contact == owned);
    world_close(&W);
    CHECK(H.live == 0 && H.bytes == 0);
}

/* A point that is none is refused, and what was answered stays. */
static void nowhere(void) {
    cloth_hooks  hooks = host_hooks(&H);
    const double about[3] = {0, NAN, 0};
    double       force[3] = {1, 2, 3}, torque[3] = {4, 5, 6};
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    CHECK(cloth_collide_wrench(W.c, W.ball, about, force, torque) == CLOTH_ERR_NONFINITE);
    CHECK(strstr(H.text, "cloth_collide_wrench: about[1] = NaN"));
    CHECK_NEAR(force[2] + torque[2], 9, 0);
    world_close(&W);
}

/* A thickness that rounding swallows, and counts that overflow, are refused. */
static void absurd(void) {
    cloth_hooks        hooks = host_hooks(&H);
    cloth_collide_desc d = cloth_collide_desc_default();
    cloth_collide     *c;
    CHECK(world_open(&W, CLOTH_INTEGRATOR_EULER, &hooks, NULL) == CLOTH_OK);
    cloth_collide_destroy(W.c);
    W.c = NULL;
    d.thickness = 1e-14;
    CHECK(cloth_collide_create(W.sim, &d, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(strstr(H.text, "collide.thickness = 1e-14"));
    d = cloth_collide_desc_default();
    d.max_passes = 2147483647;
    CHECK(cloth_collide_create(W.sim, &d, &c) == CLOTH_ERR_ARGUMENT && !c);
    CHECK(strstr(H.text, "collide.max_passes = 2147483647"));
    world_close(&W);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(gaps);
    RUN(inexact);
    RUN(nothing_near);
    RUN(numbers);
    RUN(exempt);
    RUN(forgotten);
    RUN(whose_snapshot);
    RUN(removal_taken_back);
    RUN(whose_parts);
    RUN(bytes);
    RUN(nowhere);
    RUN(absurd);
    return TEST_END();
}
