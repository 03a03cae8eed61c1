/* test_pose.c - obstacles by pose, surfaces that move, friction that changes, and the wrench:
 * against the same by vertices, Coulomb's law, weight and angular momentum.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_pose.c -lm
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"

#include "test.h"
#include "host.h"
#include "validate/friction.h"

#define H (1.0 / 60)

static const double one[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

/* By `angle` about y, or about (1, 2, 2)/3. */
static void rotation(double angle, int askew, double *R) {
    const double u[3] = {askew ? 1.0 / 3 : 0, askew ? 2.0 / 3 : 1, askew ? 2.0 / 3 : 0};
    const double c = cos(angle), s = sin(angle);
    int          i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            const int k = 3 - i - j;
            R[3 * i + j] = (1 - c) * u[i] * u[j] + (i == j ? c : 0);
            if (i != j) R[3 * i + j] += ((j - i + 3) % 3 == 1 ? -s : s) * u[k];
        }
}

static cloth_obstacle add(fric *s, cloth_obstacle_kind kind, const double *x, double radius,
                          double mu) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    o.kind = kind, o.x = x, o.radius = radius, o.friction = mu;
    CHECK(cloth_collide_add(s->contact, &o, &id) == CLOTH_OK);
    return id;
}

/* --- a pose is what its vertices are --- */

/* A box, a capsule, a sphere that fly under a sheet and turn: by pose (1), or by their vertices.
 * Fills x [25 x 3] of the sheet. */
static void flies(cloth_obstacle_kind kind, int pose, int turn, double *x) {
    double         start[24] = {0.05, -0.05, 0.02, 0.05, -0.05, 0.08}, at[24], R[9], p[3];
    const double   mid[3] = {0.05, -0.05, 0.05}, half[3] = {0.03, 0.02, 0.04};
    const int      n = kind == CLOTH_OBSTACLE_BOX ? 8 : kind == CLOTH_OBSTACLE_CAPSULE ? 2 : 1;
    cloth_obstacle id;
    fric           s;
    int            i, j, k, step;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    s.desc.tolerance = 1e-6;
    if (!fric_start(&s)) exit(2);
    if (n == 8) cloth_obstacle_box(mid, half, NULL, start);
    id = add(&s, kind, start, n < 8 ? 0.02 : 0, 0.4);
    for (step = 1; step <= 30; step++) {
        rotation(turn ? 0.02 * step : 0, 1, R);
        for (k = 0; k < 3; k++) {           /* about the middle, upwards */
            p[k] = mid[k] + (k == 1 ? 0.002 * step : 0);
            for (j = 0; j < 3; j++) p[k] -= R[3 * k + j] * mid[j];
        }
        for (i = 0; i < n; i++)
            for (k = 0; k < 3; k++) {
                at[3 * i + k] = p[k];
                for (j = 0; j < 3; j++) at[3 * i + k] += R[3 * k + j] * start[3 * i + j];
            }
        if (pose) CHECK(cloth_collide_pose(s.contact, id, turn ? R : NULL, p) == CLOTH_OK);
        else CHECK(cloth_collide_move(s.contact, id, at) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    }
    memcpy(x, cloth_sim_state(s.sim)->x, 75 * sizeof(double));
    fric_end(&s);
}

static void vertices(void) {
    double x[2][75], worst;
    int    i, turn;
    for (turn = 0; turn < 2; turn++) {
        flies(CLOTH_OBSTACLE_BOX, 1, turn, x[0]);
        flies(CLOTH_OBSTACLE_BOX, 0, turn, x[1]);
        CHECK(memcmp(x[0], x[1], sizeof x[0]) == 0);
    }
    flies(CLOTH_OBSTACLE_SPHERE, 1, 0, x[0]);
    flies(CLOTH_OBSTACLE_SPHERE, 0, 0, x[1]);
    CHECK(memcmp(x[0], x[1], sizeof x[0]) == 0);
    flies(CLOTH_OBSTACLE_CAPSULE, 1, 0, x[0]);
    flies(CLOTH_OBSTACLE_CAPSULE, 0, 0, x[1]);
    CHECK(memcmp(x[0], x[1], sizeof x[0]) == 0);
    flies(CLOTH_OBSTACLE_SPHERE, 1, 1, x[1]);   /* that it turns is felt */
    for (worst = 0, i = 0; i < 75; i++) worst = fmax(worst, fabs(x[0][i] - x[1][i]));
    CHECK(worst > 1e-4);
}

/* --- surfaces --- */

/* A sheet on a plane: carried off by the plane's way, or by its surface's. Returns the way after
 * each of 40 steps in way [40]. */
static void belt_of(int surface, double mu, double speed, double *way) {
    double         ground[3] = {0, 0, 0}, v[3] = {0, 0, 0}, x0;
    cloth_obstacle id;
    fric           s;
    int            n;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    fric_place(&s, 0, 0, FRIC_T / 2, 0);
    if (!fric_start(&s)) exit(2);
    id = add(&s, CLOTH_OBSTACLE_PLANE, ground, 0, mu);
    for (n = 0; n < 40; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    x0 = fric_mean(&s, cloth_sim_state(s.sim)->x, 0);
    v[0] = speed;
    if (surface) CHECK(cloth_collide_set_surface(s.contact, id, v, NULL) == CLOTH_OK);
    for (n = 0; n < 40; n++) {
        ground[0] += speed * H;
        if (!surface) CHECK(cloth_collide_move(s.contact, id, ground) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        way[n] = fric_mean(&s, cloth_sim_state(s.sim)->x, 0) - x0;
    }
    CHECK_NEAR(fric_mean(&s, cloth_sim_state(s.sim)->v, 0), speed, 1e-5);
    fric_end(&s);
}

/* It is left behind by v^2/(2 mu g), whatever moves. */
static void conveyor(void) {
    const double mu = 0.25, speed = 0.6;
    double       way[2][40], worst = 0;
    int          k, n;
    for (k = 0; k < 2; k++) belt_of(k, mu, speed, way[k]);
    for (n = 0; n < 40; n++) worst = fmax(worst, fabs(way[0][n] - way[1][n]));
    printf("  conveyor: left behind by %.5f m, v^2/(2 mu g) %.5f; a plane that moves differs by "
           "%.1e m\n", 40 * H * speed - way[1][39], 0.5 * speed * speed / (mu * FRIC_G), worst);
    CHECK(worst < 1e-7);
    CHECK_NEAR(40 * H * speed - way[1][39], 0.5 * speed * speed / (mu * FRIC_G),
               0.5 * speed * H + 1e-4);
}

/* Angular momentum about the y axis through (cx, ., cz), kg m^2/s, and the moment of inertia. */
static double momentum(const fric *s, double cx, double cz, double *inertia) {
    const cloth_state *q = cloth_sim_state(s->sim);
    const double      *mass = cloth_sim_params(s->sim)->mass;
    double             L = 0;
    int                i;
    for (*inertia = 0, i = 0; i < s->nv; i++) {
        const double x = q->x[3 * i] - cx, z = q->x[3 * i + 2] - cz;
        L += mass[i] * (z * q->v[3 * i] - x * q->v[3 * i + 2]);
        *inertia += mass[i] * (x * x + z * z);
    }
    return L;
}

/* A sheet draped over a sphere that begins to spin about y, by poses (0), by its surface (1): its
 * torque is what changes the sheet's angular momentum, and it comes to go as the sphere's surface
 * does, 1.8 mm farther out. Returns its rate over the sphere's. */
static double spins(int surface, double omega, int substeps) {
    const double   center[3] = {0.1, -0.1, 0.1}, spin[3] = {0, omega, 0};
    double         R[9], p[3], L, before, inertia, force[3], torque[3];
    double         worst = 0, most = 0, rate = 0;
    cloth_obstacle id;
    fric           s;
    int            n, j, k;
    fric_sheet(&s, 9, 9, 0.2, 0.2);
    s.desc.material.membrane = 300;
    s.desc.tolerance = 1e-8;
    s.desc.substeps = substeps;
    if (!fric_start(&s)) exit(2);
    id = add(&s, CLOTH_OBSTACLE_SPHERE, center, 0.095, 0.5);
    for (n = 0; n < 40; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    if (surface) CHECK(cloth_collide_set_surface(s.contact, id, NULL, spin) == CLOTH_OK);
    before = momentum(&s, 0.1, 0.1, &inertia);
    for (n = 1; n <= 60; n++) {
        rotation(omega * n * H, 0, R);
        for (k = 0; k < 3; k++)
            for (p[k] = center[k], j = 0; j < 3; j++) p[k] -= R[3 * k + j] * center[j];
        if (!surface) CHECK(cloth_collide_pose(s.contact, id, R, p) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        L = momentum(&s, 0.1, 0.1, &inertia);
        CHECK(cloth_collide_wrench(s.contact, id, center, force, torque) == CLOTH_OK);
        worst = fmax(worst, fabs(torque[1] + (L - before) / H));
        most = fmax(most, fabs(torque[1]));
        before = L;
        if (n > 50) rate += L / inertia / (10 * omega);
    }
    printf("  a sphere spins, by its %s: torque up to %.2e N m, off the change of momentum by "
           "%.1e; at the end %.4f of its rate\n", surface ? "surface" : "pose", most, worst, rate);
    if (substeps < 2) CHECK(most > 1e-6 && worst < 0.03 * most);  /* forces: of the last one */
    fric_end(&s);
    return rate;
}

static void drum(void) {
    CHECK_NEAR(spins(0, 1.5, 1), 0.095 / 0.0968, 2e-3);
    CHECK_NEAR(spins(0, 1.5, 2), 0.095 / 0.0968, 2e-3);     /* each has half of the turn */
    CHECK_NEAR(spins(1, 1.5, 1), 0.095 / 0.0968, 2e-3);
    CHECK_NEAR(spins(1, -1.5, 1), 0.095 / 0.0968, 2e-3);
}

/* R x + p turns by `angle` about y through m [3]. */
static void about(double angle, const double *m, double *R, double *p) {
    int k, j;
    rotation(angle, 0, R);
    for (k = 0; k < 3; k++)
        for (p[k] = m[k], j = 0; j < 3; j++) p[k] -= R[3 * k + j] * m[j];
}

/* How far the sheet's mean velocity is from omega about y through (cx, ., cz), and up, m/s. */
static double behind(const fric *s, double omega, double cx, double cz) {
    const cloth_state *q = cloth_sim_state(s->sim);
    const double vx = omega * (fric_mean(s, q->x, 2) - cz) - fric_mean(s, q->v, 0);
    const double vz = omega * (cx - fric_mean(s, q->x, 0)) - fric_mean(s, q->v, 2);
    const double vy = fric_mean(s, q->v, 1);
    return sqrt(vx * vx + vy * vy + vz * vz);
}

/* A capsule along x turns about y through its middle, whichever end is the first: its axis carries
 * cloth, which its turn beyond that did once more (-0.39 or -0.10 m/s along z for -0.15). */
static void capsule(void) {
    const double mid[3] = {0.02, -0.1, 0.02};
    int          swap, n;
    for (swap = 0; swap < 2; swap++) {
        double         x[6] = {-0.33, -0.1, 0.02, 0.37, -0.1, 0.02}, R[9], p[3];
        cloth_obstacle id;
        fric           s;
        fric_sheet(&s, 5, 5, 0.04, 0.04);
        fric_place(&s, 0, 0.13, FRIC_T - 1e-4, 0);
        if (!fric_start(&s)) exit(2);
        if (swap) x[0] = 0.37, x[3] = -0.33;
        id = add(&s, CLOTH_OBSTACLE_CAPSULE, x, 0.1, 1);
        for (n = -20; n <= 12; n++) {
            about(fmax(n, 0) * H, mid, R, p);
            if (n > 0) CHECK(cloth_collide_pose(s.contact, id, R, p) == CLOTH_OK);
            CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        }
        printf("  capsule that turns: cloth %.1e m/s behind it\n", behind(&s, 1, 0.02, 0.02));
        CHECK(behind(&s, 1, 0.02, 0.02) < 3e-3);
        fric_end(&s);
    }
}

/* A sheet 0.25 m from the axis of a plane, a grid and a mesh whose surface turns, once around: it
 * goes with it (stood still on a plane and a grid) and stays as far off. */
static void turntable(void) {
    static const cloth_obstacle_kind kind[3] = {CLOTH_OBSTACLE_PLANE, CLOTH_OBSTACLE_GRID,
                                                CLOTH_OBSTACLE_MESH};
    static const int faces[12] = {0, 2, 1, 0, 3, 2, 0, 4, 3, 0, 1, 4};
    static double    phi[1000];
    const double     spin[3] = {0, 3, 0};
    int              m, n;
    for (m = 0; m < 3; m++) {
        double              x[15] = {-0.2, 0, 0.05, -1, 0, -1, 1, 0, -1, 1, 0, 1, -1, 0, 1};
        double              r[2] = {0, 0};
        cloth_grid          g = {{10, 10, 10}, {-0.9, -0.9, -0.9}, 0.2, 0.5, phi};
        cloth_obstacle_desc o = cloth_obstacle_desc_default();
        cloth_obstacle      id;
        fric                s;
        for (n = 0; n < 1000; n++) phi[n] = fmax(-0.5, fmin(0.5, -0.9 + 0.2 * (n / 10 % 10)));
        fric_sheet(&s, 5, 5, 0.1, 0.1);
        fric_place(&s, 0, 0, FRIC_T - 1e-4, 0);
        if (!fric_start(&s)) exit(2);
        o.kind = kind[m], o.x = x, o.friction = 1, o.grid = m == 1 ? &g : NULL;
        o.nv = 5, o.nf = 4, o.faces = faces;
        CHECK(cloth_collide_add(s.contact, &o, &id) == CLOTH_OK);
        for (n = 0; n < 20; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        CHECK(cloth_collide_set_surface(s.contact, id, NULL, spin) == CLOTH_OK);
        for (n = 0; n < 140; n++) {
            CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
            if (n == 14 || n == 139)
                r[n > 14] = hypot(fric_mean(&s, cloth_sim_state(s.sim)->x, 0) - x[0],
                                  fric_mean(&s, cloth_sim_state(s.sim)->x, 2) - x[2]);
        }
        printf("  turntable of kind %d: cloth %.1e m/s behind, in one turn from %.4f to %.4f m\n",
               (int)kind[m], behind(&s, 3, x[0], x[2]), r[0], r[1]);
        CHECK(behind(&s, 3, x[0], x[2]) < 0.03);
        CHECK_REL(r[1], r[0], 0.02);
        fric_end(&s);
    }
}

/* Eight turns on a plane whose surface turns about one axis, told about three points of it: the
 * sheet stays as far from the axis, wherever the first vertex is, and where it sticks. (By its
 * speed halfway of a step the surface wound outwards by (omega h)^4/8 of the radius, about an axis
 * h v/2 beside; an elastic slip that did not turn along crept 23 um a turn.) */
static void turns_without_end(void) {
    const double spin[3] = {0, 6, 0};
    int          m, n, k, last = (int)(16 * 3.14159265358979 / (6 * H));
    for (m = 0; m < 3; m++) {
        double         x[3] = {m == 1 ? 1 : -0.1, 0, m == 2 ? 0.7 : 0.05}, low = 1, high = 0, r;
        double         to[2], ahead = 0;
        const double   v[3] = {-6 * (0.05 - x[2]), 0, 6 * (-0.1 - x[0])};
        cloth_obstacle id;
        fric           s;
        fric_sheet(&s, 3, 3, 0.1, 0.1);
        fric_place(&s, 0, 0, FRIC_T - 1e-4, 0);
        s.desc.tolerance = 1e-6;
        if (!fric_start(&s)) exit(2);
        id = add(&s, CLOTH_OBSTACLE_PLANE, x, 0, 1);
        for (n = 0; n < 20; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        CHECK(cloth_collide_set_surface(s.contact, id, v, spin) == CLOTH_OK);
        for (n = 0; n < last; n++) {
            CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
            for (k = 0; k < 2; k++) to[k] = fric_mean(&s, cloth_sim_state(s.sim)->x, 2 * k);
            to[0] += 0.1, to[1] -= 0.05, r = hypot(to[0], to[1]);
            if (n == last / 8 || n == last - 1)
                ahead = remainder(atan2(to[0], to[1]) - 6 * H * n - ahead, 2 * acos(-1));
            if (n > last / 8) low = fmin(low, r), high = fmax(high, r);
        }
        printf("  eight turns, told about (%g, %g): %.6f to %.6f m from the axis, %.1e rad off\n",
               x[0], x[2], low, high, ahead);
        CHECK(low > 0.15 && high - low < 1e-3 * low);
        CHECK_NEAR(ahead, 0, 1e-8);
        fric_end(&s);
    }
}

/* A sheet at 45 degrees of latitude of a sphere that turns about y, by poses (0) or its surface:
 * gravity, which leans by `lean` towards the pole, turns along, so that nothing moves in its frame.
 * Returns the way of the sheet there in 1.5 s, m: along the meridian to the pole. */
static double meridian(int surface, int substeps, double slip, double lean) {
    const double   s0 = sqrt(0.5), n0[3] = {s0, s0, 0}, up[3] = {-s0, s0, 0}, omega = 3;
    const double   center[3] = {0, 0, 0}, spin[3] = {0, omega, 0};
    double         R[9], p[3], g[3], at[2] = {0, 0};
    cloth_obstacle id;
    fric           s;
    int            n, i, j, k;
    fric_sheet(&s, 5, 5, 0.02, 0.02);
    s.desc.substeps = substeps;
    s.desc.material.membrane = 300;
    s.desc.tolerance = 1e-8;
    s.collide.slip = slip;
    for (i = 0; i < s.nv; i++) {
        const double u = s.x[3 * i] - 0.01, v = s.x[3 * i + 2] - 0.01;
        for (k = 0; k < 3; k++) s.x[3 * i + k] = 0.2018 * n0[k] - u * up[k] + (k == 2 ? v : 0);
    }
    if (!fric_start(&s)) exit(2);
    id = add(&s, CLOTH_OBSTACLE_SPHERE, center, 0.2, 1);
    for (n = -39; n <= 120; n++) {
        about(omega * H * fmax(n, 0), center, R, p);
        for (k = 0; k < 3; k++)
            for (g[k] = 0, j = 0; j < 3; j++)
                g[k] += FRIC_G * R[3 * k + j] * (lean * up[j] - n0[j]);
        CHECK(cloth_sim_set_gravity(s.sim, g) == CLOTH_OK);
        if (n == 1 && surface)
            CHECK(cloth_collide_set_surface(s.contact, id, NULL, spin) == CLOTH_OK);
        if (n > 0 && !surface) CHECK(cloth_collide_pose(s.contact, id, R, p) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        for (k = 0; k < 3 && (n == 30 || n == 120); k++)
            for (j = 0; j < 3; j++)
                at[n > 30] += up[k] * R[3 * j + k] * fric_mean(&s, cloth_sim_state(s.sim)->x, j);
    }
    fric_end(&s);
    return at[1] - at[0];
}

/* It spirals to no pole (22 and 11 mm), and its elastic slip turns as far as the sphere, which
 * slips of up to a millimetre show. */
static void latitude(void) {
    static const int surface[4] = {0, 0, 1, 1}, substeps[4] = {1, 4, 1, 4};
    double           way[4], slip = meridian(0, 4, 1e-3, 0.3);
    int              k;
    for (k = 0; k < 4; k++) {
        way[k] = meridian(surface[k], substeps[k], 1e-5, 0);
        CHECK_NEAR(way[k], 0, 1e-3);
    }
    printf("  latitude: %.2e, %.2e, %.2e, %.2e m to the pole; with large slips in 4 substeps "
           "%.2e\n", way[0], way[1], way[2], way[3], slip);
    CHECK_NEAR(slip, way[1], 1e-4);
}

/* --- friction --- */

/* Sticks on an incline at mu = 1.2 tan a, slides by Coulomb's law at 0.5, sticks again. */
static void friction(void) {
    const double   a = 0.5, c = cos(a), z = sin(a), down[3] = {0, -FRIC_G, 0}, T = 24 * H;
    double         point[3] = {0, 0, 0}, way[4], at[4], speed, mu = 0.5 * tan(a);
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle id;
    fric           s;
    uint64_t       hash[2];
    size_t         size;
    void          *buf;
    int            k, n;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    fric_place(&s, a, -z * FRIC_T / 2, c * FRIC_T / 2, 0);
    if (!fric_start(&s)) exit(2);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = point, o.friction = 1.2 * tan(a);
    o.normal[0] = -z, o.normal[1] = c;
    CHECK(cloth_collide_add(s.contact, &o, &id) == CLOTH_OK);
    CHECK(cloth_sim_set_gravity(s.sim, down) == CLOTH_OK);
    for (n = 0; n < 60; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    size = cloth_sim_save_size(s.sim);
    buf = malloc(size);
    CHECK(buf && cloth_sim_save(s.sim, buf, size) == CLOTH_OK);
    hash[0] = cloth_sim_hash(s.sim);
    for (k = 0; k < 4; k++) {
        at[k] = -(c * fric_mean(&s, cloth_sim_state(s.sim)->x, 0) +
                  z * fric_mean(&s, cloth_sim_state(s.sim)->x, 1));
        CHECK(cloth_collide_set_friction(s.contact, id, (k & 1 ? 0.5 : 1.2) * tan(a)) == CLOTH_OK);
        if (k == 1) CHECK(cloth_sim_hash(s.sim) != hash[0]);
        for (n = 0; n < 24; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        way[k] = -(c * fric_mean(&s, cloth_sim_state(s.sim)->x, 0) +
                   z * fric_mean(&s, cloth_sim_state(s.sim)->x, 1)) - at[k];
    }
    speed = FRIC_G * (z - mu * c) * T;
    printf("  friction 1.2, 0.5, 1.2, 0.5 tan a: ways %.6f, %.5f, %.5f, %.5f m; sliding %.5f m\n",
           way[0], way[1], way[2], way[3], 0.5 * speed * T);
    CHECK(fabs(way[0]) < 1e-6);
    CHECK_NEAR(way[1], 0.5 * speed * T, 0.5 * speed * H + 1e-4);
    /* brakes by g (1.2 tan a cos a - sin a), which takes longer than that */
    CHECK(way[2] > way[1] && way[2] < speed * T);
    CHECK(way[3] > way[2]);
    CHECK(cloth_sim_restore(s.sim, buf, size) == CLOTH_OK);     /* and the coefficient with it */
    CHECK(cloth_sim_hash(s.sim) == hash[0]);
    for (n = 0; n < 24; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    hash[1] = cloth_sim_hash(s.sim);
    CHECK(cloth_sim_restore(s.sim, buf, size) == CLOTH_OK);
    CHECK(cloth_collide_set_friction(s.contact, id, 1.2 * tan(a)) == CLOTH_OK);
    for (n = 0; n < 24; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_sim_hash(s.sim) == hash[1]);
    free(buf);
    fric_end(&s);
}

/* A pose that a move or a teleport replaces before the step turns nothing (0.15 m/s before). */
static void replaced(void) {
    const double   center[3] = {0.05, -0.5017, 0.05};
    double         R[9], p[3];
    cloth_obstacle id;
    fric           s;
    int            k, n;
    for (k = 0; k < 2; k++) {
        fric_sheet(&s, 5, 5, 0.1, 0.1);
        if (!fric_start(&s)) exit(2);
        id = add(&s, CLOTH_OBSTACLE_SPHERE, center, 0.5, 1);
        for (n = 0; n < 20; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        rotation(0.1, 1, R);
        for (n = 0; n < 3; n++) p[n] = center[n] - clothi_dot3(R + 3 * n, center);
        CHECK(cloth_collide_pose(s.contact, id, R, p) == CLOTH_OK);
        if (k) CHECK(cloth_collide_teleport(s.contact, id, center) == CLOTH_OK);
        else CHECK(cloth_collide_move(s.contact, id, center) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        CHECK_NEAR(fric_mean(&s, cloth_sim_state(s.sim)->v, 0), 0, 1e-6);
        fric_end(&s);
    }
}

/* A reset takes friction, surface and pose back to what was added. */
static void reset(void) {
    const double   center[3] = {0.05, -0.06, 0.05}, v[3] = {1, 0, 0}, p[3] = {0, -0.5, 0};
    double         R[9];
    cloth_obstacle id;
    fric           s;
    uint64_t       start, end;
    int            n, k;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    if (!fric_start(&s)) exit(2);
    id = add(&s, CLOTH_OBSTACLE_SPHERE, center, 0.05, 0.5);
    for (k = 0; k < 2; k++) {               /* gcc 12, -march=icelake-server: 1 1 1 0 1 0 0 0 1 */
        for (n = 0; n < 18; n++)
            CHECK_NEAR(s.contact->obstacle[0].turn[n / 9][n % 9], n % 9 % 4 == 0, 0);
        CHECK(cloth_sim_reset(s.sim) == CLOTH_OK);
    }
    start = cloth_sim_hash(s.sim);
    for (n = 0; n < 20; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    end = cloth_sim_hash(s.sim);
    rotation(0.3, 1, R);
    CHECK(cloth_collide_set_friction(s.contact, id, 0.1) == CLOTH_OK);
    CHECK(cloth_collide_set_surface(s.contact, id, v, v) == CLOTH_OK);
    CHECK(cloth_collide_pose(s.contact, id, R, p) == CLOTH_OK);
    CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_sim_reset(s.sim) == CLOTH_OK);
    CHECK(cloth_sim_hash(s.sim) == start);
    for (n = 0; n < 20; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_sim_hash(s.sim) == end);
    fric_end(&s);
}

/* A step that is cut short turns an obstacle by its part of the turn: a ball spins by 1 to 3 rad
 * while a plane comes up and would press the sheet's pins. The next step has the rest to go. */
static void halved(void) {
    const double angle[3] = {1, 2, 3}, center[3] = {0.05, -0.5, 0.05};
    int          m, i, j, k;
    for (m = 0; m < 3; m++) {
        double         R[9], want[9], p[3], up[3] = {0, -0.03, 0}, worst = 0;
        cloth_obstacle ball, plane;
        cloth_report   r;
        fric           s;
        fric_sheet(&s, 3, 3, 0.1, 0.1);
        fric_place(&s, 0, 0, 0.01, 0);
        if (!fric_start(&s)) exit(2);
        ball = add(&s, CLOTH_OBSTACLE_SPHERE, center, 0.1, 0.3);
        plane = add(&s, CLOTH_OBSTACLE_PLANE, up, 0, 0.3);
        for (i = 0; i < s.nv; i++)
            CHECK(cloth_sim_pin(s.sim, i, CLOTH_AXIS_ALL, NULL) == CLOTH_OK);
        rotation(0.4, m == 1, R);
        for (k = 0; k < 3; k++)
            for (p[k] = center[k], j = 0; j < 3; j++) p[k] -= R[3 * k + j] * center[j];
        CHECK(cloth_collide_pose(s.contact, ball, R, p) == CLOTH_OK);
        CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        rotation(0.4 + angle[m], m == 1, R);
        for (k = 0; k < 3; k++)
            for (p[k] = center[k], j = 0; j < 3; j++) p[k] -= R[3 * k + j] * center[j];
        CHECK(cloth_collide_pose(s.contact, ball, R, p) == CLOTH_OK);
        up[1] = 0.03;                       /* through the sheet from half of the way on */
        CHECK(cloth_collide_move(s.contact, plane, up) == CLOTH_OK);
        CHECK(cloth_collide_step(s.contact, H, 4, &r) == CLOTH_OK);
        CHECK_NEAR(cloth_collide_last(s.contact).fraction, 0.5, 0);
        rotation(0.4 + 0.5 * angle[m], m == 1, want);
        for (i = 0; i < 9; i++) {
            const clothi_obstacle *o = s.contact->obstacle;
            worst = fmax(worst, fabs(o->turn[0][i] - want[i]));
            CHECK_NEAR(o->turn[1][i], R[i], 0);
        }
        CHECK(worst < 1e-14);
        fric_end(&s);
    }
}

/* --- the wrench --- */

/* A sheet at rest on a plane, on a box and on a sphere: its weight, the moment of its weight, and
 * the opposite of what the vertices feel. */
static void wrench(void) {
    static const cloth_obstacle_kind kind[3] = {CLOTH_OBSTACLE_PLANE, CLOTH_OBSTACLE_BOX,
                                                CLOTH_OBSTACLE_SPHERE};
    const double mid[3] = {0.05, -0.02, 0.05}, half[3] = {0.2, 0.02, 0.2};
    const double about[3] = {0.3, 0.1, -0.2};
    int          m, i, k, n;
    for (m = 0; m < 3; m++) {
        double         x[24] = {0.05, 0, 0.05}, force[3], torque[3], f[243], sum[3] = {0, 0, 0};
        double         moment[3] = {0, 0, 0}, origin[2][3], weight = 0;
        const double  *mass;
        cloth_obstacle id, other;
        cloth_state   *q;
        fric           s;
        fric_sheet(&s, 9, 9, 0.1, 0.1);
        fric_place(&s, 0, 0, FRIC_T / 2 + (m == 2 ? 1e-3 : 0), 0);
        if (!fric_start(&s)) exit(2);
        if (m == 1) cloth_obstacle_box(mid, half, NULL, x);
        if (m == 2) x[1] = -0.2;
        id = add(&s, kind[m], x, m == 2 ? 0.2 : 0, 0.6);
        x[1] = -3, x[0] = x[2] = 9;
        other = add(&s, CLOTH_OBSTACLE_SPHERE, x, 0.1, 0.3);
        for (n = 0; n < 240; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
        q = cloth_sim_state(s.sim), mass = cloth_sim_params(s.sim)->mass;
        CHECK(cloth_collide_wrench(s.contact, id, about, force, torque) == CLOTH_OK);
        CHECK(cloth_collide_forces(s.contact, f) == CLOTH_OK);
        for (i = 0; i < s.nv; i++) {
            const double w = -FRIC_G * mass[i];     /* r x (0, w, 0) */
            moment[0] -= (q->x[3 * i + 2] - about[2]) * w;
            moment[2] += (q->x[3 * i] - about[0]) * w;
            weight -= w;
            for (k = 0; k < 3; k++) sum[k] += f[3 * i + k];
        }
        printf("  wrench: force off the weight by %.1e, torque off its moment by %.1e of it\n",
               fabs(force[1] / weight + 1), sqrt(pow(torque[0] - moment[0], 2) + pow(torque[1], 2) +
                                                 pow(torque[2] - moment[2], 2)) / (0.3 * weight));
        CHECK_NEAR(force[0], 0, 1e-4 * weight);
        CHECK_REL(force[1], -weight, 1e-4);
        CHECK_NEAR(force[2], 0, 1e-4 * weight);
        for (k = 0; k < 3; k++) {
            CHECK_NEAR(force[k], -sum[k], 1e-12 * weight);
            CHECK_NEAR(torque[k], moment[k], 3e-4 * 0.3 * weight);
        }
        CHECK(cloth_collide_wrench(s.contact, id, NULL, origin[0], origin[1]) == CLOTH_OK);
        for (k = 0; k < 3; k++) {           /* about another point: r x F more */
            const int    i1 = (k + 1) % 3, i2 = (k + 2) % 3;
            CHECK_NEAR(origin[1][k] - torque[k], about[i1] * force[i2] - about[i2] * force[i1],
                       1e-13);
        }
        CHECK(cloth_collide_wrench(s.contact, other, NULL, force, torque) == CLOTH_OK);
        for (k = 0; k < 3; k++) CHECK(!(fabs(force[k]) > 0) && !(fabs(torque[k]) > 0));
        fric_end(&s);
    }
}

/* A vertex of given mass that no face has rests on a plane, by the mean area of the others (it sank
 * by half each few steps, to NaN). */
static void lone(void) {
    static const double x[12] = {0, 0.05, 0, 0.1, 0.05, 0, 0, 0.05, 0.1, 0.3, 0.01, 0.3};
    static const double mass[4] = {1e-3, 1e-3, 1e-3, 1e-3}, origin[3] = {0, 0, 0};
    static const int    face[3] = {0, 2, 1};
    double              f[12];
    fric                s;
    int                 n;
    fric_sheet(&s, 2, 2, 0.1, 0.1);
    s.desc.x_rest = s.desc.x = x, s.desc.v = NULL, s.desc.nf = 1, s.desc.faces = face;
    s.desc.vertex_mass = mass, s.desc.sleep = 0;
    if (!fric_start(&s)) exit(2);
    (void)add(&s, CLOTH_OBSTACLE_PLANE, origin, 0, 0.3);
    for (n = 0; n < 200; n++) CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_collide_forces(s.contact, f) == CLOTH_OK);
    CHECK(cloth_sim_state(s.sim)->x[10] > 0.5 * FRIC_T);
    CHECK_REL(f[10], FRIC_G * mass[3], 1e-6);
    fric_end(&s);
}

/* --- refusals --- */

static host HOST;

static int said(cloth_status status, cloth_status want, const char *what) {
    const int ok = status == want && HOST.errors == 1 && strstr(HOST.text, what) != NULL;
    if (!ok) printf("    status %d, %d sentences: %s\n", (int)status, HOST.errors, HOST.text);
    host_forget(&HOST);
    return ok;
}

static void refusals(void) {
    const double   center[3] = {0.05, -1, 0.05}, zero[3] = {0, 0, 0}, half[3] = {0, 0.5, 0};
    const double   bad[3] = {0, NAN, 0};
    double         R[9], force[3] = {7, 7, 7}, torque[3];
    cloth_obstacle ball, plane, none = {0};
    fric           s;
    uint64_t       before;
    fric_sheet(&s, 3, 3, 0.1, 0.1);
    s.desc.hooks = host_hooks(&HOST);
    if (!fric_start(&s)) exit(2);
    ball = add(&s, CLOTH_OBSTACLE_SPHERE, center, 0.1, 0.3);
    plane = add(&s, CLOTH_OBSTACLE_PLANE, center, 0, 0.3);
    CHECK(cloth_step(s.sim, H, NULL) == CLOTH_OK);
    before = cloth_sim_hash(s.sim);
    host_forget(&HOST);
    memcpy(R, one, sizeof R);
#define REFUSED(call, status, what) CHECK(said(call, status, what))
    REFUSED(cloth_collide_pose(s.contact, none, R, zero), CLOTH_ERR_HANDLE, "cloth_collide_pose");
    REFUSED(cloth_collide_pose(s.contact, ball, R, NULL), CLOTH_ERR_ARGUMENT, "p is NULL");
    REFUSED(cloth_collide_pose(s.contact, ball, R, bad), CLOTH_ERR_NONFINITE, "p[1] = NaN");
    R[4] = NAN;
    REFUSED(cloth_collide_pose(s.contact, ball, R, zero), CLOTH_ERR_NONFINITE, "R[4] = NaN");
    R[4] = -1;
    REFUSED(cloth_collide_pose(s.contact, ball, R, zero), CLOTH_ERR_ARGUMENT, "no rotation");
    R[4] = 1.001;
    REFUSED(cloth_collide_pose(s.contact, ball, R, zero), CLOTH_ERR_ARGUMENT, "no rotation");
    rotation(0.1, 1, R);
    REFUSED(cloth_collide_pose(s.contact, plane, R, zero), CLOTH_ERR_UNSUPPORTED, "plane");
    REFUSED(cloth_collide_set_friction(s.contact, none, 0.1), CLOTH_ERR_HANDLE, "set_friction");
    REFUSED(cloth_collide_set_friction(s.contact, ball, -1), CLOTH_ERR_ARGUMENT, "friction = -1");
    REFUSED(cloth_collide_set_friction(s.contact, ball, 2e3), CLOTH_ERR_ARGUMENT, "= 2000");
    REFUSED(cloth_collide_set_friction(s.contact, ball, NAN), CLOTH_ERR_NONFINITE, "NaN");
    REFUSED(cloth_collide_set_surface(s.contact, none, zero, zero), CLOTH_ERR_HANDLE, "surface");
    REFUSED(cloth_collide_set_surface(s.contact, ball, bad, zero), CLOTH_ERR_NONFINITE, "v[1]");
    REFUSED(cloth_collide_set_surface(s.contact, ball, NULL, bad), CLOTH_ERR_NONFINITE, "omega[1]");
    REFUSED(cloth_collide_wrench(s.contact, none, NULL, force, torque), CLOTH_ERR_HANDLE, "wrench");
    REFUSED(cloth_collide_wrench(s.contact, ball, NULL, NULL, torque), CLOTH_ERR_ARGUMENT, "NULL");
    REFUSED(cloth_collide_wrench(s.contact, ball, NULL, force, NULL), CLOTH_ERR_ARGUMENT, "NULL");
    CHECK(cloth_collide_pose(NULL, ball, R, zero) == CLOTH_ERR_HANDLE);
    CHECK(cloth_collide_wrench(NULL, ball, NULL, force, torque) == CLOTH_ERR_HANDLE);
    CHECK(cloth_sim_hash(s.sim) == before && force[0] >= 7);
    memcpy(R, one, sizeof R);
    R[1] = -0.0;                            /* a rotation by the angle 0 */
    CHECK(cloth_collide_pose(s.contact, plane, R, half) == CLOTH_OK);
    CHECK(cloth_sim_hash(s.sim) != before);     /* the target is state */
    fric_end(&s);
    CHECK(HOST.live == 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(vertices);
    RUN(conveyor);
    RUN(drum);
    RUN(capsule);
    RUN(turntable);
    RUN(turns_without_end);
    RUN(latitude);
    RUN(friction);
    RUN(replaced);
    RUN(reset);
    RUN(halved);
    RUN(wrench);
    RUN(lone);
    RUN(refusals);
    return TEST_END();
}
