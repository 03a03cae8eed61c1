/* 07_host_loop.c - how a game hosts the cloth: its own frames, a fixed step, a hand that grabs.
 *
 * Notice: the accumulator turns frames of any length into steps of one length, so the motion does
 * not depend on the frame rate; what is drawn lies between the last two steps.
 * cloth_sim_vertices_f32() fills the game's interleaved buffer (stride) relative to the camera's
 * origin, so floats stay exact 4 km from the world's origin. cloth_sim_ray() finds what is under
 * the mouse; cloth_sim_attach(), _move() and cloth_sim_detach() pull it.
 * The budget: hooks.cancel is asked in each Newton iteration and answers 2, finish now, once 4 ms
 * are spent: where the iteration under way leads is accepted. The cloth is less accurate then, but
 * free of new intersections, and it moves in every frame. (Answer 1 gives the step up: a cloth
 * frozen as long as it is dear.) desc.max_newton is the other lever: the same cap for every step,
 * so the motion repeats to the bit, which a clock's does not. A capsule keeps walking through.
 * Script: grab at 1.2 s, let go at 2.4 s, pause from 3.2 to 3.6 s, reset in frame 210.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. 07_host_loop.c -lm
 *   page:     out/07_host_loop.html
 *   expected: 225 frames, 228 steps, 1 grab, 0 frames frozen, a gap to the walker always: yes
 *
 * Exercises: (1) H = 1.0 / 30: half the steps and still no jerks, until alpha = 1 in draw();
 * (2) GRAB_K = 300: the hand pulls a spike out of one triangle. */
#include "clothsim_collide.h"
#include "view.h"
#include <time.h>

#define N      31               /* vertices along a side            */
#define H      (1.0 / 60)       /* s, the fixed step                */
#define BUDGET 0.004            /* s of CPU time, of a step         */
#define GRAB_K 30.0             /* N/m, of the hand                 */
#define RADIUS 0.12             /* m, of the capsule that walks     */
#define STRIDE 8                /* floats: position, normal, uv     */
typedef struct game {
    cloth_sim       *sim;
    double           origin[3];             /* m, where the camera's floats begin    */
    float            last[N * N * STRIDE], now[N * N * STRIDE];
    double           accumulator, deadline; /* s not yet stepped; s of CPU time      */
    cloth_attachment hand;                  /* id 0: nothing held                    */
    double           depth, grip[3];        /* m, along the ray; where it pulls      */
    int              steps, grabs, hurried, frozen;
    double           worst;                 /* s, most that a step took over BUDGET  */
    double           gap;                   /* m, smallest to the walker             */
    cloth_collide   *contact;
    cloth_obstacle   walker;
    double           end[6], way;           /* m, of the capsule's axis; how far it went */
} game;

static double seconds(void) { return (double)clock() / CLOCKS_PER_SEC; }
static int    over_budget(void *user) { return seconds() > ((game *)user)->deadline ? 2 : 0; }

/* Where the capsule's axis ends are: it walks along -z. */
static void walker_at(game *g) {
    for (int k = 0; k < 6; k++)
        g->end[k] = g->origin[k % 3] +
                    (k % 3 == 0 ? 0.7 : k == 1 ? 0.5 : k == 4 ? 1.1 : 1.5 - g->way);
}

/* The mouse: a ray o + t d from the eye through the point that the script moves to. */
static cloth_status mouse(game *g, double t, int pressed) {
    double s = fmin(fmax((t - 1.2) / 1.2, 0), 1), bary[3], o[3] = {0.5, 1.5, 3}, d[3];
    int    face, hit = 0;
    cloth_attachment hand;
    d[0] = 0.08 - 0.1 * sin(3.1416 * s), d[1] = -0.2 + 0.1 * s, d[2] = -1;
    for (int k = 0; k < 3; k++) o[k] += g->origin[k];
    if (pressed && !g->hand.id) hit = cloth_sim_ray(g->sim, o, d, &g->depth, &face, bary);
    for (int k = 0; k < 3; k++) g->grip[k] = o[k] + (1 - 0.12 * s) * g->depth * d[k];
    g->grabs += hit;
    if (hit) return cloth_sim_attach(g->sim, face, bary, GRAB_K, g->grip, &g->hand);
    if (!g->hand.id) return CLOTH_OK;
    if (pressed) return cloth_sim_attach_move(g->sim, g->hand, g->grip);
    hand = g->hand, g->hand.id = 0;
    return cloth_sim_detach(g->sim, hand);
}

/* Two buffers of the start: else a frame would lie between before and after the reset. */
static cloth_status restart(game *g) {
    cloth_status status = cloth_sim_reset(g->sim);
    g->accumulator = g->way = 0;
    walker_at(g);
    if (!status) status = cloth_collide_teleport(g->contact, g->walker, g->end);
    if (!status) status = cloth_sim_vertices_f32(g->sim, g->origin, g->now, g->now + 3,
                                                 STRIDE * sizeof(float));
    memcpy(g->last, g->now, sizeof g->now);
    return status;
}

/* Steps until the accumulator holds less than one. */
static cloth_status advance(game *g, double dt) {
    cloth_status status = CLOTH_OK;
    cloth_report report;
    for (g->accumulator += dt; g->accumulator >= H && !status; g->steps++, g->accumulator -= H) {
        g->way += 0.8 * H;
        walker_at(g);
        status = cloth_collide_move(g->contact, g->walker, g->end);
        g->deadline = seconds() + BUDGET;
        if (!status) status = cloth_step(g->sim, H, &report);
        g->worst = fmax(g->worst, seconds() - g->deadline);
        if (status) return status;
        g->hurried += report.outcome == CLOTH_STEP_MAX_ITERATIONS;
        g->gap = fmin(g->gap, report.smallest_gap);
        memcpy(g->last, g->now, sizeof g->now);
        status = cloth_sim_vertices_f32(g->sim, g->origin, g->now, g->now + 3,
                                        STRIDE * sizeof(float));
        g->frozen += !memcmp(g->last, g->now, sizeof g->now);
    }
    return status;
}

/* What a renderer would show: the two last buffers mixed. */
static void draw(const game *g, view *page, const int *mesh, double t) {
    const double way[18] = {1,0,0, -1,0,0, 0,1,0, 0,-1,0, 0,0,1, 0,0,-1};
    double x[3 * N * N], ball[18], unit[3], capsule[3 * VIEW_BALL_NV];
    double alpha = fmin(g->accumulator / H, 1);
    for (int i = 0; i < 3 * N * N; i++) {
        int at = STRIDE * (i / 3) + i % 3;
        x[i] = (1 - alpha) * (double)g->last[at] + alpha * (double)g->now[at];
    }
    for (int i = 0; i < 18; i++)            /* the hand, small when it holds nothing */
        ball[i] = g->grip[i % 3] - g->origin[i % 3] + (g->hand.id ? 0.04 : 0.015) * way[i];
    view_time(page, t);
    view_put(page, mesh[0], x, NULL, NULL);
    view_put(page, mesh[1], ball, NULL, NULL);
    for (int i = 0; i < VIEW_BALL_NV; i++) {        /* a ball, drawn out along the axis */
        view_ball_point(i, unit);
        for (int k = 0; k < 3; k++)
            capsule[3 * i + k] =
                g->end[k + (unit[1] > 0 ? 3 : 0)] - g->origin[k] + RADIUS * unit[k];
    }
    view_put(page, mesh[2], capsule, NULL, NULL);
}

int main(void) {
    static const int ball[24] = {0,2,4, 2,1,4, 1,3,4, 3,0,4, 2,0,5, 1,2,5, 3,1,5, 0,3,5};
    static game  g;                         /* zero */
    cloth_desc   desc = cloth_desc_default();
    cloth_mesh  *sheet = NULL;
    cloth_model *model = NULL;
    cloth_status status;
    cloth_pin    pins[2] = {{0, CLOTH_AXIS_ALL}, {N - 1, CLOTH_AXIS_ALL}};
    view        *page = NULL;
    const char  *error = NULL;
    double       t = 0, dt;
    int          frames = 1, mesh[3];
    cloth_obstacle_desc walker = cloth_obstacle_desc_default();
    desc.hooks.log.fn = cloth_log_stderr;
    desc.hooks.cancel.fn = over_budget, desc.hooks.cancel.user = &g;
    g.origin[0] = 4000, g.origin[2] = -1000, g.depth = 2.9, g.gap = 1;
    status = cloth_mesh_sheet(&desc.hooks, CLOTH_SHEET_ALTERNATING, N, N, 1.0, 1.0, &sheet);
    if (status) goto end;
    for (int i = 0; i < 3 * sheet->nv; i++) sheet->x[i] += g.origin[i % 3] + (i % 3 == 1 ? 1.6 : 0);
    cloth_desc_set_mesh(&desc, sheet), desc.contact = CLOTH_CONTACT_OBSTACLES;
    desc.npins = 2, desc.pins = pins, desc.wind_on = 1;
    if ((status = cloth_model_create(&desc, &model)) != CLOTH_OK) goto end;
    if ((status = cloth_sim_create(model, &g.sim)) != CLOTH_OK) goto end;
    if ((status = cloth_collide_create(g.sim, NULL, &g.contact)) != CLOTH_OK) goto end;
    walker_at(&g);
    walker.kind = CLOTH_OBSTACLE_CAPSULE, walker.x = g.end, walker.radius = RADIUS;
    if ((status = cloth_collide_add(g.contact, &walker, &g.walker)) != CLOTH_OK) goto end;
    if ((status = restart(&g)) != CLOTH_OK) goto end;
    page = view_open("A cloth in a game's loop", "Uneven frames drawn between steps of 1/60 s; "
        "grabbed at 1.2 s, let go at 2.4 s, paused from 3.2 s to 3.6 s, reset at 3.9 s.");
    view_camera(page, 30, 10), view_floor(page, 0.4);
    mesh[0] = view_mesh(page, "cloth", VIEW_CLOTH, sheet->nv, sheet->nf, sheet->faces);
    view_pattern(page, mesh[0], sheet->X), mesh[2] = view_ball(page, "walker");
    mesh[1] = view_mesh(page, "hand", VIEW_OBSTACLE, 6, 8, ball);
    for (; frames <= 225 && !status; frames++) {
        dt = frames % 3 ? 0.016 : 0.024;            /* s, as uneven as a busy screen's */
        status = mouse(&g, t, t > 1.2 && t < 2.4);
        if (!status && frames == 210) status = restart(&g);
        if (!status && !(t > 3.2 && t < 3.6))       /* pause: draw, but no time passes */
            status = advance(&g, dt);
        t += dt;
        draw(&g, page, mesh, t);
    }
    error = view_close(page, "out/07_host_loop.html");
end:
    if (status) fprintf(stderr, "%s\n", cloth_status_text(status));
    if (error) fprintf(stderr, "%s\n", error);
    printf("finished early: %d of %d steps; the worst took %.1f ms more than its %.0f\n", g.hurried,
           g.steps, 1e3 * g.worst, 1e3 * BUDGET);
    printf("%d frames, %d steps, %d grab, %d frames frozen, a gap to the walker always: %s\n",
           frames - 1, g.steps, g.grabs, g.frozen, g.gap > 0 ? "yes" : "no");
    cloth_collide_destroy(g.contact);
    cloth_sim_destroy(g.sim), cloth_model_destroy(model), cloth_mesh_destroy(&desc.hooks, sheet);
    return status != CLOTH_OK || error != NULL;
}
