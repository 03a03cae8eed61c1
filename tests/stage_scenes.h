/* stage_scenes.h - scenes of contact at any size.
 * Include after stage.h. n: vertices along a side; steps: how many to take. */
#ifndef CLOTH_TEST_STAGE_SCENES_H
#define CLOTH_TEST_STAGE_SCENES_H

#define STAGE_PI 3.14159265358979323846

/* A sheet of 1 m falls on a sphere of 0.3 m, its corners on a plane. */
static inline void scene_drape(int n, int steps, double h, cloth_integrator integrator,
                               const char *name) {
    stage  s;
    double start;
    int    i;
    stage_sheet(&s, n, 1);
    s.desc.integrator = integrator;
    if (stage_start(&s)) {
        stage_sphere(&s, 0.5, -0.31, 0.5, 0.3);
        stage_plane(&s, -0.7, 0.3);
        start = stage_energy(&s);
        for (i = 0; i < steps; i++) (void)stage_step(&s, h);
        stage_judge(&s, name);
        CHECK(stage_energy(&s) < start);
    }
    stage_end(&s);
}

/* A sheet of 0.5 m lies on a plane; one side is led over to the other and let go. */
static inline void scene_fold(int n, int steps, double h) {
    stage  s;
    double t, to[3];
    int    i, j;
    stage_sheet(&s, n, 0.5);
    for (i = 0; i < s.mesh->nv; i++) s.mesh->x[3 * i + 1] = 0.0015;
    if (stage_start(&s)) {
        stage_plane(&s, 0, 0.5);
        for (i = 0; i < steps; i++) {
            t = 1.25 * (i + 1) / steps;     /* half a circle about the middle, then falls */
            for (j = 0; j < n; j++) {
                const int v = j * n;
                if (t > 0.9) {
                    (void)cloth_sim_unpin(s.sim, v);
                    continue;
                }
                to[0] = 0.25 - 0.24 * cos(STAGE_PI * t) - 0.01 * (1 - t);
                to[1] = 0.0015 + 0.24 * sin(STAGE_PI * t);
                to[2] = s.mesh->x[3 * v + 2];
                (void)cloth_sim_pin(s.sim, v, CLOTH_AXIS_ALL, to);
            }
            (void)stage_step(&s, h);
        }
        stage_judge(&s, "fold");
    }
    stage_end(&s);
}

/* What there is falls on a plane. */
static inline void scene_fall(stage *s, int steps, double h, const char *name) {
    int i;
    if (stage_start(s)) {
        stage_plane(s, 0, 0.3);
        for (i = 0; i < steps; i++) (void)stage_step(s, h);
        stage_judge(s, name);
    }
    stage_end(s);
}

/* A sheet of 0.5 m stands on its side and falls: folds of every size. */
static inline void scene_crumple(int n, int steps, double h) {
    stage s;
    stage_sheet(&s, n, 0.5);
    stage_upright(&s);
    scene_fall(&s, steps, h, "crumple");
}

/* Five sheets of 0.4 m, each turned a little, fall on a plane and on each other. */
static inline void scene_stack(int n, int steps, double h) {
    stage s;
    stage_layers(&s, 5, n, 0.02);
    scene_fall(&s, steps, h, "stack");
}

/* A disc of radius 0.35 m is pulled by its middle through a ring of 0.1 m, 0.8 m in the time. */
static inline void scene_ring(int rings, int steps, double h) {
    cloth_mesh *mesh = NULL;
    shape       ring = {0, 0, NULL, NULL};
    stage       s;
    double      to[3] = {0, 0, 0};
    int         i, j;
    if (cloth_mesh_disc(NULL, 0.35, rings, &mesh)) exit(2);
    for (i = 0; i < mesh->nv; i++) {
        mesh->x[3 * i] += 0.003;
        mesh->x[3 * i + 1] = 0.05;
    }
    stage_cloth(&s, mesh);
    if (stage_start(&s)) {
        shape_torus(&ring, 0.13, 0.03, 48, 16);
        for (i = 0; i < ring.nv; i++) {     /* its axis from z to y */
            const double y = ring.x[3 * i + 1];
            ring.x[3 * i + 1] = ring.x[3 * i + 2];
            ring.x[3 * i + 2] = -y;
        }
        stage_mesh(&s, &ring, 0.1);
        for (i = 0; i < steps; i++) {
            for (j = 0; j < 7; j++) {
                to[0] = s.mesh->x[3 * j];
                to[1] = 0.05 - 0.8 * (i + 1) / steps;
                to[2] = s.mesh->x[3 * j + 2];
                (void)cloth_sim_pin(s.sim, j, CLOTH_AXIS_ALL, to);
            }
            (void)stage_step(&s, h);
        }
        stage_judge(&s, "ring");
    }
    shape_free(&ring);
    stage_end(&s);
}

/* A tube of radius 0.1 m and height 0.4 m, its ends held: one turns by `turns`, and they approach
 * by 0.12 m. After the second turn it is a rope under a tension of some 200 N/m, and buckles in
 * every step by more than contact lets it. Newton is cut at 20 iterations: where it ends is
 * feasible, and the promise is the same. */
static inline void scene_twist(int around, double turns, int steps, double h) {
    const int   along = (int)(1.3 * around) | 1;
    cloth_mesh *mesh = NULL;
    stage       s;
    int         i, j;
    if (cloth_mesh_tube(NULL, 0.1, 0.4, around, along, &mesh)) exit(2);
    stage_cloth(&s, mesh);
    s.desc.gravity[1] = 0;
    s.desc.max_newton = 20;
    if (stage_start(&s)) {
        for (i = 0; i < steps; i++) {
            const double t = (double)(i + 1) / steps, a = 2 * STAGE_PI * turns * t;
            for (j = 0; j < around; j++) {
                const int     top = (along - 1) * around + j;
                const double *x = s.mesh->x + 3 * top;
                double        to[3];
                to[0] = cos(a) * x[0] - sin(a) * x[2];
                to[1] = 0.4 - 0.12 * t;
                to[2] = sin(a) * x[0] + cos(a) * x[2];
                (void)cloth_sim_pin(s.sim, j, CLOTH_AXIS_ALL, s.mesh->x + 3 * j);
                (void)cloth_sim_pin(s.sim, top, CLOTH_AXIS_ALL, to);
            }
            (void)stage_step(&s, h);
        }
        stage_judge(&s, "twist");
        CHECK(s.rigid <= steps / 20);       /* else the ends turn and the rope does not */
    }
    stage_end(&s);
}

/* The sphere as a mesh that turns at 3 rad/s with a sheet on it; at rest for a quarter. */
static inline void scene_spin(int n, int steps, double h) {
    static const double centre[3] = {0, 0, 0};
    shape               ball = {0, 0, NULL, NULL};
    stage               s;
    double              angle = 0;
    int                 i, j, id;
    stage_sheet(&s, n, 0.9);
    for (i = 0; i < s.mesh->nv; i++) {
        s.mesh->x[3 * i] -= 0.45;
        s.mesh->x[3 * i + 1] = 0.31;
        s.mesh->x[3 * i + 2] -= 0.45;
    }
    if (stage_start(&s)) {
        shape_sphere(&ball, centre, 0.3, 16);
        shape_turn(&ball, 0);
        id = stage_mesh(&s, &ball, 0.5);
        for (i = 0; i < steps; i++) {
            if (i >= steps / 4) angle += 3 * h;
            for (j = 0; j < ball.nv; j++) {
                const double *x = ball.x + 3 * j;
                double       *to = s.thing[id].next + 3 * j;
                to[0] = cos(angle) * x[0] + sin(angle) * x[2];
                to[1] = x[1];
                to[2] = -sin(angle) * x[0] + cos(angle) * x[2];
            }
            (void)stage_step(&s, h);
        }
        stage_judge(&s, "spin");
    }
    shape_free(&ball);
    stage_end(&s);
}

/* A ball of 0.1 m flies at 20 m/s, 2/3 m a step, through the middle of a curtain of 1 m that hangs
 * from hooks along its upper side. A hook lets go where the cloth under it is stretched by 0.3,
 * about 15 N: the ball goes on with the curtain around it. */
static inline void scene_ball(int n, int steps) {
    stage  s;
    int    i, k, id;
    double h = 1.0 / 30;
    stage_sheet(&s, n, 1);
    for (i = 0; i < s.mesh->nv; i++) {
        double *x = s.mesh->x + 3 * i;
        x[1] = -x[2];
        x[2] = 0.002 * sin(9 * x[0]);
    }
    if (stage_start(&s)) {
        for (i = 0; i < n; i++) (void)cloth_sim_pin(s.sim, i, CLOTH_AXIS_ALL, NULL);
        id = stage_sphere(&s, 0.52, -0.5, -1, 0.1);
        for (i = 0; i < steps; i++) {
            s.thing[id].next[2] = s.thing[id].x[2] + 20 * h;
            (void)stage_step(&s, h);
            for (k = 0; k < n; k++) {
                const double *p = s.state->x + 3 * k, *q = s.state->x + 3 * (k + n);
                const double  a = p[0] - q[0], b = p[1] - q[1], c = p[2] - q[2];
                if (sqrt(a * a + b * b + c * c) * (n - 1) > 1.3) (void)cloth_sim_unpin(s.sim, k);
            }
        }
        stage_judge(&s, "ball");
    }
    stage_end(&s);
}

#endif
