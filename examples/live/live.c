/* live.c - the scene of the live page: a curtain of 30 x 30 vertices and a ball, stepped by a host
 * that is a browser. Compiled to WebAssembly by live.sh, or to a program that prints a hash:
 * and draws the gallery's still, out/live.png:
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I../.. -I.. live.c -lm && ./a.out
 *
 * Notice: the host owns the time. Steps are of 1/60 s whatever the screen does; max_newton bounds
 * what a step costs, and hooks.cancel answers 2 (finish now) where a pull makes it dearer than the
 * frame has: the cloth then moves on less accurately, but without an intersection, and never
 * freezes. Nothing here but [2.4] and [2.5] of clothsim.h and [2.5] of clothsim_collide.h. */
#ifdef __wasm__
#define CLOTHSIM_IMPLEMENTATION
#endif
#include "clothsim_collide.h"
#include <math.h>
#include <string.h>

#define N      30               /* vertices along a side                               */
#define H      (1.0 / 60)       /* s                                                   */
#define NEWTON 4                /* iterations a step at most                           */
#define GRAB_K 40.0             /* N/m, of the hand                                    */
#define SPEED  0.05             /* m, most that the ball is moved in a step            */

#ifdef __wasm__
#define EXPORT(name) __attribute__((export_name(#name)))
__attribute__((import_module("host"), import_name("now"))) double host_now(void);       /* ms */
#else
#define EXPORT(name)
static double host_now(void) { return 0; }
#endif

typedef struct scene {
    cloth_mesh      *sheet;
    cloth_model     *model;
    cloth_sim       *sim;
    cloth_collide   *contact;
    cloth_obstacle   ball;
    cloth_attachment hand;
    double center[3], goal[3], radius;      /* m, of the ball: where it is, where it is led   */
    double pointer[6];                      /* the mouse's ray: origin, direction             */
    double depth, offset[3];                /* along it, of what is held; the ball's centre   */
    double deadline;                        /* ms, 0: none                                    */
    double budget;                          /* ms a step may take, 0: as long as it likes     */
    int    holds;                           /* 0 nothing, 1 the cloth, 2 the ball             */
} scene;
static scene s;

static int finish_now(void *user) {
    (void)user;
    return s.deadline > 0 && host_now() > s.deadline ? 2 : 0;
}

/* 0, or a cloth_status. Called again it begins anew. */
EXPORT(live_start) int live_start(void) {
    cloth_status        status;
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_pin           pins[5];
    cloth_collide_destroy(s.contact), cloth_sim_destroy(s.sim), cloth_model_destroy(s.model);
    cloth_mesh_destroy(NULL, s.sheet);
    memset(&s, 0, sizeof s);
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, 1.0, 1.0, &s.sheet);
    if (status) return status;
    for (int i = 0; i < s.sheet->nv; i++) {         /* upright, its first row on top */
        s.sheet->x[3 * i + 1] = 1.2 - s.sheet->x[3 * i + 2];
        s.sheet->x[3 * i + 2] = 0;
        s.sheet->x[3 * i] -= 0.5;
    }
    for (int i = 0; i < 5; i++) pins[i].vertex = i * (N - 1) / 4, pins[i].axes = CLOTH_AXIS_ALL;
    desc.nv = s.sheet->nv, desc.x_rest = s.sheet->x;
    desc.nf = s.sheet->nf, desc.faces = s.sheet->faces;
    desc.npins = 5, desc.pins = pins;
    desc.material.membrane = 300, desc.material.damping = 0.01;
    desc.max_newton = NEWTON;
    desc.contact = CLOTH_CONTACT_OBSTACLES;
    desc.wind_on = 1;
    desc.hooks.cancel.fn = finish_now;
    status = cloth_model_create(&desc, &s.model);
    if (!status) status = cloth_sim_create(s.model, &s.sim);
    if (!status) status = cloth_collide_create(s.sim, NULL, &s.contact);
    s.radius = 0.16, s.center[0] = 0.1, s.center[1] = 0.62, s.center[2] = 0.2;
    memcpy(s.goal, s.center, sizeof s.goal);
    s.goal[2] = -0.12;                              /* it goes into the cloth by itself */
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = s.center, ball.radius = s.radius;
    if (!status) status = cloth_collide_add(s.contact, &ball, &s.ball);
    return status;
}

EXPORT(live_nv) int live_nv(void) { return s.sheet->nv; }
EXPORT(live_nf) int live_nf(void) { return s.sheet->nf; }
EXPORT(live_x) double *live_x(void) { return cloth_sim_state(s.sim)->x; }
EXPORT(live_X) double *live_X(void) { return s.sheet->X; }
EXPORT(live_faces) int *live_faces(void) { return s.sheet->faces; }
EXPORT(live_center) double *live_center(void) { return s.center; }
EXPORT(live_radius) double live_radius(void) { return s.radius; }
EXPORT(live_pointer) double *live_pointer(void) { return s.pointer; }
EXPORT(live_set_budget) void live_set_budget(double ms) { s.budget = ms; }

EXPORT(live_wind) int live_wind(double x, double y, double z) {
    const double w[3] = {x, y, z};
    return cloth_sim_set_wind(s.sim, w);
}

EXPORT(live_stiffness) int live_stiffness(double membrane) {        /* N/m */
    cloth_material m = cloth_material_default();
    m.membrane = membrane, m.damping = 0.01;
    return cloth_sim_set_material(s.sim, 0, &m);
}

EXPORT(live_friction) int live_friction(double mu) {
    return cloth_collide_set_friction(s.contact, s.ball, mu);
}

/* Distance along the ray to the ball, or -1. */
static double hit_ball(const double *o, const double *d) {
    double a = 0, b = 0, c = -s.radius * s.radius, root;
    for (int k = 0; k < 3; k++) {
        const double r = o[k] - s.center[k];
        a += d[k] * d[k], b += r * d[k], c += r * r;
    }
    root = b * b - a * c;
    return root < 0 ? -1 : (-b - sqrt(root)) / a;
}

/* The pointer goes down on its ray: what it holds then, 0 nothing, 1 the cloth, 2 the ball. */
EXPORT(live_grab) int live_grab(void) {
    const double *o = s.pointer, *d = s.pointer + 3, ball = hit_ball(o, d);
    double        t = 0, bary[3], at[3];
    int           face = 0;
    s.holds = 0;
    if (cloth_sim_ray(s.sim, o, d, &t, &face, bary) && !(ball > 0 && ball < t)) {
        for (int k = 0; k < 3; k++) at[k] = o[k] + t * d[k];
        if (!cloth_sim_attach(s.sim, face, bary, GRAB_K, at, &s.hand)) s.holds = 1, s.depth = t;
    } else if (ball > 0) s.holds = 2, s.depth = ball;
    for (int k = 0; k < 3; k++) s.offset[k] = s.center[k] - o[k] - s.depth * d[k];
    return s.holds;
}

/* It moves, at the depth where it took hold less what it was drawn closer (m). */
EXPORT(live_drag) int live_drag(double closer) {
    double at[3];
    s.depth -= closer;
    for (int k = 0; k < 3; k++) at[k] = s.pointer[k] + s.depth * s.pointer[3 + k];
    if (s.holds == 1) return cloth_sim_attach_move(s.sim, s.hand, at);
    for (int k = 0; k < 3 && s.holds == 2; k++) s.goal[k] = at[k] + s.offset[k];
    return CLOTH_OK;
}

EXPORT(live_drop) int live_drop(void) {
    const int held = s.holds;
    s.holds = 0;
    return held == 1 ? cloth_sim_detach(s.sim, s.hand) : CLOTH_OK;
}

/* One step. The ball goes towards its goal, SPEED at most; a step that fails leaves the cloth, and
 * the ball waits. */
EXPORT(live_step) int live_step(void) {
    double       next[3], way = 0, part;
    cloth_status status;
    for (int k = 0; k < 3; k++) next[k] = s.goal[k] - s.center[k], way += next[k] * next[k];
    way = sqrt(way), part = way > SPEED ? SPEED / way : 1;
    if (way > 0 && s.holds != 2 && part * way > 0.01) part = 0.01 / way;     /* the opening */
    for (int k = 0; k < 3; k++) next[k] = s.center[k] + part * next[k];
    status = cloth_collide_move(s.contact, s.ball, next);
    s.deadline = s.budget > 0 ? host_now() + s.budget : 0;
    if (!status) status = cloth_step(s.sim, H, NULL);
    if (!status) memcpy(s.center, next, sizeof next);
    return status;
}

/* FNV-1a over the bits of x and v; its halves, for hosts without 64-bit numbers. */
EXPORT(live_hash) unsigned live_hash(int high) {
    const cloth_state *state = cloth_sim_state(s.sim);
    uint64_t           h = UINT64_C(14695981039346656037), bits;
    for (int i = 0; i < 6 * N * N; i++) {
        memcpy(&bits, (i < 3 * N * N ? state->x : state->v - 3 * N * N) + i, sizeof bits);
        for (int k = 0; k < 64; k += 8) h = (h ^ (bits >> k & 255)) * UINT64_C(1099511628211);
    }
    return (unsigned)(high ? h >> 32 : h & 0xffffffffu);
}

#ifndef __wasm__
#include "view.h"
#include <time.h>

/* The still beside the page, by way of a view of one frame. */
static const char *still(void) {
    static double x[3 * VIEW_BALL_NV];
    view         *page = view_open("Live!", "");
    int           mesh[2];
    view_camera(page, 24, 8), view_floor(page, 0);
    mesh[0] = view_mesh(page, "cloth", VIEW_CLOTH, live_nv(), live_nf(), live_faces());
    view_pattern(page, mesh[0], live_X()), mesh[1] = view_ball(page, "ball");
    for (int i = 0; i < VIEW_BALL_NV; i++) {
        view_ball_point(i, x + 3 * i);
        for (int k = 0; k < 3; k++) x[3 * i + k] = s.center[k] + s.radius * x[3 * i + k];
    }
    view_time(page, 0);
    view_put(page, mesh[0], live_x(), NULL, NULL), view_put(page, mesh[1], x, NULL, NULL);
    return view_close(page, "out/live.html");
}

int main(void) {
    const char *error;
    double      worst = 0;
    int         status = live_start();
    for (int i = 0; i < 60 && !status; i++) {
        const clock_t begin = clock();
        status = live_step();
        worst = fmax(worst, (double)(clock() - begin) / CLOCKS_PER_SEC);
    }
    fprintf(stderr, "%.1f ms a step, the worst %.1f\n", 1e3 * (double)clock() / CLOCKS_PER_SEC / 60,
            1e3 * worst);
    if (status) printf("%s\n", cloth_status_text((cloth_status)status));
    else printf("%08x%08x\n", live_hash(1), live_hash(0));
    if ((error = still()) != NULL) fprintf(stderr, "%s\n", error);
    return status != 0 || error != NULL;
}
#endif
