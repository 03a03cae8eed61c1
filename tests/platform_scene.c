/* platform_scene.c - three short motions and the hashes of their bits, for tests/platforms.sh.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. platform_scene.c -o platform_scene -lm
 *
 *   contact   a sheet falls on a corner of a mesh and on a ball, SELF, friction, EULER, 3/8 s; and
 *             what the generators of round meshes make
 *   bdf2      a pinned sheet swings, BDF2, quadratic bending, wind, 0.25 s
 *   leapfrog  the same by LEAPFROG
 *
 * Prints 'platform_scene HASH HASH HASH pairs N' and nothing else; N: pairs that intersect. A hash
 * is FNV-1a over the numbers of x and v as 64 bits, so the order of bytes in memory plays no part,
 * nor do the pointers and sizes of the platform. The host calls nothing of libm. */
#ifdef PLATFORM_WINDOWS_FIRST
#include <windows.h>                /* its macros (near, far, small, min, max ...) come before us */
#endif
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include <stdio.h>

#define N 12                        /* vertices along a side                                   */

static uint64_t hash_numbers(uint64_t h, int n, const double *a) {
    for (int i = 0; i < n; i++) {
        uint64_t bits;
        memcpy(&bits, a + i, sizeof bits);
        for (int k = 0; k < 64; k += 8) h = (h ^ (bits >> k & 255)) * UINT64_C(1099511628211);
    }
    return h;
}

static uint64_t hash_sim(cloth_sim *sim) {
    const cloth_state *s = cloth_sim_state(sim);
    return hash_numbers(hash_numbers(UINT64_C(14695981039346656037), 3 * N * N, s->x), 3 * N * N,
                        s->v);
}

/* the vertices of round meshes, whose angles libm's would round each in its own way */
static cloth_status hash_round(uint64_t *h) {
    cloth_mesh  *m[3] = {NULL, NULL, NULL};
    cloth_status status = cloth_mesh_tube(NULL, 0.3, 0.6, 31, 17, &m[0]);
    if (!status) status = cloth_mesh_disc(NULL, 0.4, 9, &m[1]);
    if (!status) status = cloth_mesh_ball(NULL, 0.25, 24, &m[2]);
    for (int i = 0; i < 3; i++) {
        if (!status) *h = hash_numbers(*h, 3 * m[i]->nv, m[i]->x);
        cloth_mesh_destroy(NULL, m[i]);
    }
    return status;
}

/* a tetrahedron that points upwards beside the middle, and a ball on its other side */
static cloth_status obstacles(cloth_collide *c) {
    static const double x[12] = {0.30, -0.06, 0.45, 0.05, -0.5, 0.2, 0.30, -0.5, 0.85,
                                 0.60, -0.5,  0.2};
    static const int    faces[12] = {0, 2, 3, 0, 1, 2, 0, 3, 1, 1, 3, 2};
    static const double center[3] = {0.75, -0.3, 0.5};
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_status        status;
    d.kind = CLOTH_OBSTACLE_MESH, d.nv = 4, d.nf = 4, d.x = x, d.faces = faces;
    status = cloth_collide_add(c, &d, &id);
    d = cloth_obstacle_desc_default();
    d.kind = CLOTH_OBSTACLE_SPHERE, d.x = center, d.radius = 0.2;
    return status ? status : cloth_collide_add(c, &d, &id);
}

static cloth_status run(cloth_desc desc, int steps, uint64_t *hash, int *pairs) {
    cloth_model   *model = NULL;
    cloth_sim     *sim = NULL;
    cloth_collide *c = NULL;
    cloth_status   status = cloth_model_create(&desc, &model);
    if (!status) status = cloth_sim_create(model, &sim);
    if (!status && pairs) status = cloth_collide_create(sim, NULL, &c);
    if (!status && pairs) status = obstacles(c);
    for (int i = 0; i < steps && !status; i++) status = cloth_step(sim, 1.0 / 64, NULL);
    if (!status) *hash = hash_sim(sim);
    if (!status && pairs) status = cloth_collide_intersections(c, 0, NULL, pairs);
    cloth_collide_destroy(c), cloth_sim_destroy(sim), cloth_model_destroy(model);
    return status;
}

int main(void) {
    const cloth_pin pins[2] = {{0, CLOTH_AXIS_ALL}, {N - 1, CLOTH_AXIS_ALL}};
    cloth_mesh     *sheet = NULL;
    cloth_desc      desc = cloth_desc_default(), swing;
    uint64_t        hash[3] = {0, 0, 0};
    int             pairs = 0;
    cloth_status    status =
        cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, N, N, 1.0, 1.0, &sheet);
    if (status) return 1;
    desc.nv = sheet->nv, desc.x_rest = sheet->x, desc.nf = sheet->nf, desc.faces = sheet->faces;
    swing = desc;
    desc.contact = CLOTH_CONTACT_SELF;
    swing.npins = 2, swing.pins = pins, swing.bend = CLOTH_BEND_QUADRATIC;
    swing.wind_on = 1, swing.wind[0] = 1, swing.wind[2] = 3;
    swing.material.membrane = 200;
    status = run(desc, 24, &hash[0], &pairs);
    if (!status) status = hash_round(&hash[0]);
    swing.integrator = CLOTH_INTEGRATOR_BDF2;
    if (!status) status = run(swing, 16, &hash[1], NULL);
    swing.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    if (!status) status = run(swing, 16, &hash[2], NULL);
    printf("platform_scene");
    for (int k = 0; k < 3; k++)
        printf(" %08lx%08lx", (unsigned long)(hash[k] >> 32),
               (unsigned long)(hash[k] & 0xffffffffu));
    printf(" pairs %d\n", pairs);
    if (status) printf("%s\n", cloth_status_text(status));
    cloth_mesh_destroy(NULL, sheet);
    return status != CLOTH_OK || pairs != 0;
}
