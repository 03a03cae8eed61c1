/* test_ledger.c - contact's forces against statics and the change of momentum; contact's rows of
 * the ledger against closed forms and against implicit Euler's loss, worked out from the states.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_ledger.c -lm
 * tier: quick */
#include "../clothsim_collide.h"

#include "test.h"
#include "validate/friction.h"

#define H        (1.0 / 60)

/* A step, and what was before it. */
typedef struct scene {
    fric          s;
    cloth_state  *state;
    const double *mass;
    double       *x, *v;                    /* [nv x 3] at the start of the last step          */
    double       *f, *friction;             /* [nv x 3] N                                      */
    double        before;                   /* J, total at the start of the last step          */
    cloth_report  r;
    int           zones;                    /* steps that began with any                       */
} scene;

static double *vectors(const scene *q) {
    double *a = (double *)calloc(3 * (size_t)q->s.nv, sizeof(double));
    if (!a) exit(2);
    return a;
}

static int scene_start(scene *q) {
    cloth_ledger l;
    if (!fric_start(&q->s)) return 0;
    q->state = cloth_sim_state(q->s.sim);
    q->mass = cloth_sim_params(q->s.sim)->mass;
    q->x = vectors(q), q->v = vectors(q), q->f = vectors(q), q->friction = vectors(q);
    CHECK(cloth_sim_energy(q->s.sim, &l) == CLOTH_OK);
    q->r.energy.total = l.total;
    return 1;
}

static void scene_end(scene *q) {
    free(q->x), free(q->v), free(q->f), free(q->friction);
    fric_end(&q->s);
}

static double unbalanced;                   /* of m g, after any step                          */

/* One step; the ledger's sums, and that the forces are the change of momentum. */
static void scene_step(scene *q, double scale) {
    const cloth_ledger *l = &q->r.energy;
    const size_t bytes = 3 * (size_t)q->s.nv * sizeof(double);
    double       sum[3] = {0, 0, 0}, gravity[3], m = 0;
    int          i, k;
    memcpy(q->x, q->state->x, bytes);
    memcpy(q->v, q->state->v, bytes);
    q->before = l->total;
    memcpy(gravity, q->s.desc.gravity, sizeof gravity);
    CHECK(cloth_step(q->s.sim, H, &q->r) == CLOTH_OK);
    CHECK(cloth_collide_forces(q->s.contact, q->f) == CLOTH_OK);
    CHECK(cloth_collide_friction(q->s.contact, q->friction) == CLOTH_OK);
    q->zones += cloth_collide_last(q->s.contact).zones > 0;
    CHECK_NEAR(l->total, l->kinetic + l->stretch + l->bend + l->gravity + l->attach + l->other,
               1e-12 * scale);
    CHECK_NEAR(l->total - q->before,
               l->wind_work + l->force_work + l->pin_work + l->contact_work - l->damping_loss -
                   l->friction_loss - l->zone_loss - l->numerical_loss, 1e-12 * scale);
    if (q->s.desc.integrator != CLOTH_INTEGRATOR_EULER || q->s.desc.npins ||
        q->s.desc.substeps > 1)             /* forces are those of the last one                */
        return;
    for (i = 0; i < 3 * q->s.nv; i++) {
        const double dv = q->state->v[i] - q->v[i];
        sum[i % 3] += q->f[i] - q->mass[i / 3] * (dv / H - gravity[i % 3]);
        m += q->mass[i / 3] / 3;
    }
    /* as near as Newton's 1e-9 m balance what sticks: 2 mu N / slip = 2000 N/m at most */
    for (k = 0; k < 3; k++) {
        CHECK_NEAR(sum[k], 0, 1e-4 * m * FRIC_G);
        unbalanced = fmax(unbalanced, fabs(sum[k]) / (m * FRIC_G));
    }
}

static void balance(void) {
    OPEN_MOST(unbalanced, 2e-5, "forces that a step leaves unbalanced, of m g");
}

/* What implicit Euler loses in a step, from its definition: F = M (v - v^n)/h acted on the way to
 * the minimiser, so with E what is conservative
 *   loss = 1/2 |v - v^n|_M^2 + E(x^n) - E(x) + grad E(x).(x - x^n)
 * there. */
static double euler_loss(scene *q) {
    double e0, e1, loss;
    int    i;
    CHECK(cloth_sim_potential(q->s.sim, q->x, &e0, NULL) == CLOTH_OK);
    memset(q->f, 0, 3 * (size_t)q->s.nv * sizeof(double));
    CHECK(cloth_sim_potential(q->s.sim, q->state->x, &e1, q->f) == CLOTH_OK);
    loss = e0 - e1;
    for (i = 0; i < 3 * q->s.nv; i++) {
        const double d = q->state->x[i] - q->x[i], dv = d / H - q->v[i];
        loss += 0.5 * q->mass[i / 3] * dv * dv + q->f[i] * d;
    }
    return loss;
}

/* Component of the sum of f along (a, b, 0), and what is left of it across. */
static double along(const scene *q, const double *f, double a, double b, double *left) {
    double sum[3] = {0, 0, 0}, s;
    int    i;
    for (i = 0; i < 3 * q->s.nv; i++) sum[i % 3] += f[i];
    s = sum[0] * a + sum[1] * b;
    *left = sqrt((sum[0] - s * a) * (sum[0] - s * a) + (sum[1] - s * b) * (sum[1] - s * b) +
                 sum[2] * sum[2]);
    return s;
}

/* A sheet on an incline with mu = tan a times `part`: m g cos a along the normal; friction m g sin
 * a where it sticks, mu m g cos a where it slides, up the slope. The plane, or a mesh. */
static void incline_of(double part, int mesh) {
    const double a = 0.5, c = cos(a), z = sin(a), mu = part * tan(a);
    const double down[3] = {0, -FRIC_G, 0};
    double       press[3] = {0, 0, 0}, weight, pushed, rubbed, left;
    int          i;
    scene        q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    fric_place(&q.s, a, 0.6 * c - z * FRIC_T / 2, 0.6 * z + c * FRIC_T / 2, 0.45);
    press[0] = FRIC_G * z, press[1] = -FRIC_G * c;
    weight = 0.2 * 0.1 * 0.1 * FRIC_G;
    if (!scene_start(&q) || !CHECK(fric_ground(&q.s, a, mu, mesh, 0.17) == CLOTH_OK)) exit(2);
    CHECK(cloth_sim_set_gravity(q.s.sim, press) == CLOTH_OK);
    for (i = 0; i < 30; i++) CHECK(cloth_step(q.s.sim, H, NULL) == CLOTH_OK);
    CHECK(cloth_sim_set_gravity(q.s.sim, down) == CLOTH_OK);
    for (i = 0; i < 20; i++) CHECK(cloth_step(q.s.sim, H, &q.r) == CLOTH_OK);
    memcpy(q.s.desc.gravity, down, sizeof down);
    for (i = 0; i < 10; i++) scene_step(&q, 1e-3);
    pushed = along(&q, q.f, -z, c, &left);
    rubbed = along(&q, q.friction, c, z, &left);
    printf("  mu = %.2f tan a on a %s: normal/(m g cos a) %.6f, friction/(m g sin a) %.6f\n", part,
           mesh ? "mesh" : "plane", pushed / (weight * c), rubbed / (weight * z));
    CHECK_REL(pushed, weight * c, 2e-4);
    CHECK_REL(rubbed, fmin(mu * weight * c, weight * z), 2e-4);
    CHECK(left < 1e-4 * weight);
    for (i = 0; i < q.s.nv; i++) {          /* vertex by vertex: Coulomb, and across the normal */
        const double *f = q.f + 3 * i, *t = q.friction + 3 * i;
        const double  n = f[1] * c - f[0] * z, rub = sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
        CHECK(n >= 0 && rub <= mu * n * (1 + 1e-3));
        CHECK_NEAR(t[1] * c - t[0] * z, 0, (mesh ? 1e-4 : 1e-12) * weight);
    }
    scene_end(&q);
}

static void incline(void) {
    incline_of(1.2, 0);
    incline_of(1.2, 6);
    incline_of(0.6, 0);
}

/* A far mesh is taken away (1), teleported (2) or left (0) while a sheet sticks on an incline: what
 * it sticks to is remembered. Fills x [nv x 3], returns friction over m g sin a after it. */
static double bystander(int what, int mesh, int wrote, double *x) {
    const double a = 0.5, c = cos(a), z = sin(a), weight = 0.2 * 0.1 * 0.1 * FRIC_G;
    double       far[9] = {9, 9, 9, 9.5, 9, 9, 9, 9, 9.5}, rubbed, left;
    const int    faces[3] = {0, 2, 1};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle id;
    int            i;
    scene          q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    fric_place(&q.s, a, 0.6 * c - z * FRIC_T / 2, 0.6 * z + c * FRIC_T / 2, 0.45);
    if (!scene_start(&q)) exit(2);
    o.nv = 3, o.x = far, o.nf = 1, o.faces = faces;
    CHECK(cloth_collide_add(q.s.contact, &o, &id) == CLOTH_OK);
    CHECK(fric_ground(&q.s, a, 1.2 * tan(a), mesh, 0.17) == CLOTH_OK);
    for (i = 0; i < 60; i++) CHECK(cloth_step(q.s.sim, H, &q.r) == CLOTH_OK);
    memcpy(q.x, q.state->x, 3 * (size_t)q.s.nv * sizeof(double));
    if (wrote) q.state->x[0] += 1e-9, cloth_sim_state_changed(q.s.sim);
    if (what == 1) CHECK(cloth_collide_remove(q.s.contact, id) == CLOTH_OK);
    for (i = 0; i < 9; i++) far[i] += 1;
    if (what == 2) CHECK(cloth_collide_teleport(q.s.contact, id, far) == CLOTH_OK);
    scene_step(&q, 1e-3);
    rubbed = along(&q, q.friction, c, z, &left) / (weight * z);
    for (i = 0; i < 20 && !wrote; i++) scene_step(&q, 1e-3);
    if (!wrote) CHECK(fric_moved(&q.s, q.state->x, q.x) < 2e-7);
    memcpy(x, q.state->x, 3 * (size_t)q.s.nv * sizeof(double));
    scene_end(&q);
    return rubbed;
}

static void bystanders(void) {
    double x[3][75];
    int    what, mesh;
    for (mesh = 0; mesh <= 6; mesh += 6)
        for (what = 0; what < 3; what++) {
            CHECK_REL(bystander(what, mesh, 0, x[what]), 1, 2e-3);
            CHECK(memcmp(x[what], x[0], sizeof x[0]) == 0);
        }
    /* a write to x has anchors dropped: the sheet gives once more, and sticks at once */
    CHECK_REL(bystander(1, 0, 1, x[0]), 1, 1e-2);
    CHECK_REL(bystander(0, 0, 1, x[1]), 1, 1e-2);
    CHECK(memcmp(x[1], x[0], sizeof x[0]) == 0);
}

/* A sheet that sticks on an incline, undisturbed (0); its ground is teleported to where it is (1),
 * taken away and laid again (2); a sim that has never touched it begins there (3). x [nv x 3] after
 * a step. */
static void laid_anew(int what, double *x) {
    const double a = 0.5, c = cos(a), z = sin(a);
    double       point[3] = {0, 0, 0};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle id;
    int            i;
    scene          q, other;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    fric_place(&q.s, a, 0.6 * c - z * FRIC_T / 2, 0.6 * z + c * FRIC_T / 2, 0.45);
    if (!scene_start(&q)) exit(2);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = point, o.friction = 1.2 * tan(a);
    o.normal[0] = -z, o.normal[1] = c;
    CHECK(cloth_collide_add(q.s.contact, &o, &id) == CLOTH_OK);
    for (i = 0; i < 60; i++) CHECK(cloth_step(q.s.sim, H, &q.r) == CLOTH_OK);
    if (what == 1) CHECK(cloth_collide_teleport(q.s.contact, id, point) == CLOTH_OK);
    if (what == 2) CHECK(cloth_collide_remove(q.s.contact, id) == CLOTH_OK);
    if (what == 2) CHECK(cloth_collide_add(q.s.contact, &o, &id) == CLOTH_OK);
    if (what == 3) {
        memset(&other, 0, sizeof other);
        fric_sheet(&other.s, 5, 5, 0.1, 0.1);
        memcpy(other.s.x, q.state->x, sizeof(double) * 3 * (size_t)q.s.nv);
        memcpy(other.s.v, q.state->v, sizeof(double) * 3 * (size_t)q.s.nv);
        scene_end(&q);
        q = other;
        if (!scene_start(&q)) exit(2);
        CHECK(cloth_collide_add(q.s.contact, &o, &id) == CLOTH_OK);
    }
    scene_step(&q, 1e-3);
    memcpy(x, q.state->x, sizeof(double) * 3 * (size_t)q.s.nv);
    scene_end(&q);
}

/* What a sheet sticks to is forgotten of a ground that was moved or is another: as on one that it
 * never touched the sheet gives once more, by a good part of friction's slip. */
static void laid(void) {
    double x[4][75], off[4] = {0, 0, 0, 0};
    int    what, i;
    for (what = 0; what < 4; what++) laid_anew(what, x[what]);
    for (what = 0; what < 3; what++)
        for (i = 0; i < 75; i++)
            off[what] = fmax(off[what], fabs(x[what][i] - x[3][i]));
    printf("  off one on a new ground: undisturbed %.1e, teleported %.1e, laid again %.1e m\n",
           off[0], off[1], off[2]);
    CHECK(off[0] > 1e-6 && off[1] < 1e-8 && off[2] < 1e-8);
}

/* A sheet lies on another that is pinned, pressed on it by F and sheared by S: each carries what
 * the other does. */
static void pressed(void) {
    const double F = 0.05, S = 0.01;
    double       sum[2][3] = {{0, 0, 0}, {0, 0, 0}}, rub[2][3] = {{0, 0, 0}, {0, 0, 0}};
    double      *force, total = 0;
    cloth_pin    pins[25];
    cloth_mesh  *list[2];
    int          i, half, n;
    scene        q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    list[0] = q.s.mesh, half = list[0]->nv;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 6, 6, 0.08, 0.08, list + 1) == CLOTH_OK);
    for (i = 0; i < list[1]->nv; i++)
        list[1]->x[3 * i] += 0.01, list[1]->x[3 * i + 1] = 1e-3, list[1]->x[3 * i + 2] += 0.007;
    CHECK(cloth_mesh_merge(NULL, list, 2, &q.s.mesh) == CLOTH_OK);
    cloth_mesh_destroy(NULL, list[0]), cloth_mesh_destroy(NULL, list[1]);
    n = q.s.nv = q.s.mesh->nv;
    q.s.desc.nv = n, q.s.desc.nf = q.s.mesh->nf, q.s.desc.faces = q.s.mesh->faces;
    q.s.desc.x_rest = q.s.mesh->x, q.s.desc.x = NULL, q.s.desc.v = NULL;
    q.s.desc.part = q.s.mesh->part;
    for (i = 0; i < half; i++) pins[i].vertex = i, pins[i].axes = CLOTH_AXIS_ALL;
    q.s.desc.npins = half, q.s.desc.pins = pins;
    q.s.desc.gravity[1] = 0;
    q.s.desc.contact = CLOTH_CONTACT_SELF;
    if (!scene_start(&q)) exit(2);
    force = vectors(&q);
    for (i = half; i < n; i++) total += q.mass[i];
    for (i = half; i < n; i++) force[3 * i + 1] = -F * q.mass[i] / total;
    CHECK(cloth_sim_set_force(q.s.sim, force) == CLOTH_OK);
    for (i = 0; i < 60; i++) scene_step(&q, 1e-3);
    for (i = half; i < n; i++) force[3 * i] = S * q.mass[i] / total;
    CHECK(cloth_sim_set_force(q.s.sim, force) == CLOTH_OK);
    for (i = 0; i < 60; i++) scene_step(&q, 1e-3);
    for (i = 0; i < 3 * n; i++) {
        sum[i >= 3 * half][i % 3] += q.f[i];
        rub[i >= 3 * half][i % 3] += q.friction[i];
    }
    printf("  pressed by %g, sheared by %g N: below %.6f %.6f, above %.6f %.6f N\n", F, S,
           sum[0][1], sum[0][0], sum[1][1], sum[1][0]);
    for (i = 0; i < 3; i++) {
        CHECK_NEAR(sum[0][i], -sum[1][i], 1e-14);
        CHECK_NEAR(rub[0][i], -rub[1][i], 1e-14);
    }
    CHECK_REL(sum[1][1], F, 1e-4);
    CHECK_REL(sum[1][0], -S, 1e-4);
    CHECK_REL(rub[1][0], -S, 2e-2);         /* normals between sheets are not quite upright */
    free(force);
    scene_end(&q);
}

/* A flat sheet falls 0.12 m on a plane: implicit Euler loses 1/2 m |dv|^2 a step while it is rigid,
 * (g h)^2 m/2 in the fall, and what the impact takes is that of its steps too. An implicit step
 * owes nothing to the zones, and what comes to rest has spent all. */
static void drop(void) {
    const double M = 0.2 * 0.01, gh = FRIC_G * H;
    double       euler = 0, works = 0, height, most = 0;
    int          n, i, hit = 0;
    scene        q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    fric_place(&q.s, 0, 0, 0.12, 0);
    if (!scene_start(&q) || fric_ground(&q.s, 0, 0.3, 0, 0)) exit(2);
    for (n = 1; n <= 90; n++) {
        double loss = 0;
        scene_step(&q, 1e-3);
        for (i = 0; i < 3 * q.s.nv; i++) {
            const double dv = q.state->v[i] - q.v[i];
            loss += 0.5 * q.mass[i / 3] * dv * dv;
        }
        hit += cloth_collide_last(q.s.contact).contacts > 0;
        CHECK(!(fabs(q.r.energy.zone_loss) > 0));
        CHECK_NEAR(q.r.energy.numerical_loss, loss, 1e-12);
        if (!hit) {
            CHECK_NEAR(q.r.energy.numerical_loss, 0.5 * M * gh * gh, 1e-15);
            CHECK(!(fabs(q.r.energy.contact_work) > 0) && !(q.r.energy.contact > 0));
        }
        CHECK_NEAR(q.r.energy.friction_loss, 0, 1e-12);
        euler += q.r.energy.numerical_loss;
        works += q.r.energy.contact_work;
        most = fmax(most, q.r.energy.total - q.before);
    }
    height = 0.12 - q.state->x[1];
    printf("  drop: of %.3e J Euler took %.3e; E_col gave %.1e, holds %.1e J\n",
           M * FRIC_G * height, euler, works, q.r.energy.contact);
    CHECK(hit > 0 && works < 0);            /* it brakes */
    CHECK(most < 1e-9);                     /* and never throws back more than it took */
    CHECK_NEAR(M * FRIC_G * height + works, euler, 1e-9);
    CHECK(q.r.energy.contact > 0);
    scene_end(&q);
}

/* The same by leapfrog, which loses nothing in a fall: all that is lost went to the zones. */
static void drop_leapfrog(void) {
    const double M = 0.2 * 0.01;
    double       zones = 0, worst = 0, height;
    int          n;
    scene        q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    fric_place(&q.s, 0, 0, 0.12, 0);
    q.s.desc.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    q.s.desc.material.membrane = 100;
    if (!scene_start(&q) || fric_ground(&q.s, 0, 0.3, 0, 0)) exit(2);
    for (n = 1; n <= 60; n++) {
        scene_step(&q, 1e-3);
        zones += q.r.energy.zone_loss;
        worst = fmax(worst, fabs(q.r.energy.numerical_loss));
    }
    height = 0.12 - q.state->x[1];
    printf("  drop, leapfrog: of %.6e J the zones took %.6e; numerical at most %.0e J\n",
           M * FRIC_G * height, zones, worst);
    CHECK(worst < 1e-12);
    CHECK_NEAR(zones, M * FRIC_G * height - q.r.energy.kinetic, 1e-12);
    CHECK(zones > 0.9 * M * FRIC_G * height);
    scene_end(&q);
}

/* A sheet slides to rest, or is carried off by a plane that moves: friction takes mu m g times the
 * slip, the plane gives mu m g times its own way. */
static void slide_of(double v0, double belt, int substeps) {
    const double M = 0.2 * 0.01, mu = 0.25, F = mu * M * FRIC_G, eps = 2e-5;
    const double speed = fabs(v0 - belt);
    double       rubbed = 0, worked = 0, euler = 0, way, ground[3] = {0, 0, 0}, mean;
    const double before = 0.5 * M * v0 * v0;
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle id;
    int            n, i;
    scene          q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 5, 5, 0.1, 0.1);
    fric_place(&q.s, 0, 0, FRIC_T / 2, 0);
    q.s.desc.substeps = substeps;
    if (!scene_start(&q)) exit(2);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground, o.friction = mu;
    CHECK(cloth_collide_add(q.s.contact, &o, &id) == CLOTH_OK);
    for (i = 0; i < 40; i++) scene_step(&q, 1e-3);
    for (i = 0; i < q.s.nv; i++) q.state->v[3 * i] += v0;   /* touches stay: x is as it was */
    q.r.energy.total += before;
    way = -fric_mean(&q.s, q.state->x, 0);
    for (n = 0; n < 60; n++) {
        ground[0] += belt * H;
        CHECK(cloth_collide_move(q.s.contact, id, ground) == CLOTH_OK);
        scene_step(&q, 1e-3);
        rubbed += q.r.energy.friction_loss;
        worked += q.r.energy.contact_work;
        euler += q.r.energy.numerical_loss;
        CHECK(!(fabs(q.r.energy.zone_loss) > 0));
    }
    way += fric_mean(&q.s, q.state->x, 0);
    mean = fric_mean(&q.s, q.state->v, 0);
    printf("  from %g to %g m/s: slip %.6f m, friction/(mu m g) %.6f, work %.3e, Euler %.3e J\n",
           v0, belt, fabs(way - ground[0]), rubbed / F, worked, euler);
    CHECK_NEAR(mean, belt, 1e-6);
    CHECK_NEAR(rubbed / F, fabs(way - ground[0]), eps + 1e-4 * fabs(way));
    CHECK_NEAR(rubbed / F, 0.5 * speed * speed / (mu * FRIC_G), 0.5 * speed * H + eps);
    CHECK_NEAR(before + worked, rubbed + euler + q.r.energy.kinetic, 1e-3 * F);
    if (belt > 0) CHECK_REL(worked, M * belt * belt, 0.02);  /* F times speed/(mu g) belt */
    else CHECK_NEAR(worked, 0, 1e-7);
    scene_end(&q);
}

static void slide(void) {
    slide_of(1, 0, 1);
    slide_of(0, 0.8, 1);
    slide_of(0, 0.8, 2);                   /* each substep has its own part of the plane's way    */
}

/* A step of a flat sheet on a plane: the force N goes with the sheet. */
static void lift_step(scene *q) {
    double N = 0, way = q->state->x[1] - q->x[1];
    int    i;
    for (i = 0; i < q->s.nv; i++) N += q->f[3 * i + 1];
    CHECK_NEAR(q->r.energy.contact_work, N * way, 1e-9);
    CHECK(!(fabs(q->r.energy.zone_loss) > 0));
}

/* A sheet 20 mm above a plane, whose ground[1] is 0. */
static cloth_obstacle lift_start(scene *q, cloth_integrator integrator, const double *ground) {
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    memset(q, 0, sizeof *q);
    fric_sheet(&q->s, 5, 5, 0.1, 0.1);
    fric_place(&q->s, 0, 0, 0.02, 0);
    q->s.desc.integrator = integrator;
    if (integrator == CLOTH_INTEGRATOR_LEAPFROG) q->s.desc.material.membrane = 100;
    if (!scene_start(q)) exit(2);
    o.kind = CLOTH_OBSTACLE_PLANE, o.x = ground;
    CHECK(cloth_collide_add(q->s.contact, &o, &id) == CLOTH_OK);
    return id;
}

/* A plane catches a sheet that falls, carries it up and stops. */
static void lift(void) {
    const double M = 0.2 * 0.01;
    double       ground[3] = {0, 0, 0}, worked = 0, y, y0, start;
    scene          q;
    cloth_obstacle id = lift_start(&q, CLOTH_INTEGRATOR_EULER, ground);
    int            n;
    y0 = fric_mean(&q.s, q.state->x, 1);
    start = q.r.energy.total;
    for (n = 0; n < 90; n++) {
        ground[1] += (n < 30 ? 0.5 : 0) * H;
        CHECK(cloth_collide_move(q.s.contact, id, ground) == CLOTH_OK);
        scene_step(&q, 1e-3);
        lift_step(&q);
        worked += q.r.energy.contact_work;
    }
    y = fric_mean(&q.s, q.state->x, 1);
    printf("  lifted %.4f m: work %.6e J, m g y %.6e\n", y - y0, worked, M * FRIC_G * (y - y0));
    CHECK(q.zones > 0);
    CHECK(worked > M * FRIC_G * (y - y0) && worked < M * FRIC_G * (y - y0) + 2 * M * 0.25);
    CHECK_NEAR(q.r.energy.total - start, M * FRIC_G * (y - y0), 1e-9);
    scene_end(&q);
}

/* The same by leapfrog, whose zones do it: the plane's speed times all that it pushed, M (v + g t),
 * whenever it did. What the zones take is the impact, half of M times the square of its speed. */
static void lift_leapfrog(void) {
    const double M = 0.2 * 0.01, V = 0.5;
    double       ground[3] = {0, 0, 0}, worked = 0, zones = 0, start, pushed, hit;
    scene          q;
    cloth_obstacle id = lift_start(&q, CLOTH_INTEGRATOR_LEAPFROG, ground);
    int            n;
    start = q.r.energy.total;
    for (n = 0; n < 30; n++) {
        ground[1] += V * H;
        CHECK(cloth_collide_move(q.s.contact, id, ground) == CLOTH_OK);
        scene_step(&q, 1e-3);
        worked += q.r.energy.contact_work, zones += q.r.energy.zone_loss;
    }
    pushed = M * (fric_mean(&q.s, q.state->v, 1) + FRIC_G * 30 * H);
    hit = sqrt(V * V + 2 * FRIC_G * 0.02);  /* of a fall to a plane that comes */
    printf("  lifted by leapfrog: work %.6e J, speed times momentum %.6e; the zones took %.3e\n",
           worked, V * pushed, zones);
    CHECK_NEAR(worked, V * pushed, 1e-9);
    CHECK_REL(zones, 0.5 * M * hit * hit, 0.05);
    CHECK_NEAR(q.r.energy.total - start, worked - zones, 1e-12);
    scene_end(&q);
}

/* A sheet drapes over a sphere and onto itself: whatever the contact did, the numerical loss is
 * the one that implicit Euler has without it. */
static void drape(void) {
    const double center[3] = {0.1, -0.06, 0.1};
    cloth_obstacle_desc o = cloth_obstacle_desc_default();
    double  worst = 0, rubbed = 0, worked = 0, fall;
    int     n;
    scene   q;
    memset(&q, 0, sizeof q);
    fric_sheet(&q.s, 10, 10, 0.2, 0.2);
    q.s.desc.contact = CLOTH_CONTACT_SELF;
    q.s.desc.material.membrane = 300;
    q.s.desc.tolerance = 1e-11;
    q.s.desc.cg_tolerance = 1e-8;
    if (!scene_start(&q)) exit(2);
    o.kind = CLOTH_OBSTACLE_SPHERE, o.x = center, o.radius = 0.05;
    CHECK(cloth_collide_add(q.s.contact, &o, NULL) == CLOTH_OK);
    fall = q.r.energy.total;
    for (n = 0; n < 45; n++) {
        scene_step(&q, 1e-2);
        CHECK(!(fabs(q.r.energy.zone_loss) > 0));
        rubbed += q.r.energy.friction_loss;
        worked += q.r.energy.contact_work;
        worst = fmax(worst, fabs(euler_loss(&q) - q.r.energy.numerical_loss));
    }
    printf("  drape: %d steps, %d with zones: loss by its formula off by %.1e J; friction took "
           "%.2e, contact worked %.1e of %.2e J\n", n, q.zones, worst, rubbed, worked,
           fall - q.r.energy.total);
    CHECK(q.zones > 3);
    CHECK(worst < 1e-12);
    CHECK(rubbed > 1e-5 && worked < 0);
    scene_end(&q);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(incline);
    RUN(bystanders);
    RUN(laid);
    RUN(pressed);
    RUN(drop);
    RUN(drop_leapfrog);
    RUN(slide);
    RUN(lift);
    RUN(lift_leapfrog);
    RUN(drape);
    RUN(balance);                           /* of all of these                                 */
    return TEST_END();
}
