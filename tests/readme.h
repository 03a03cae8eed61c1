/* readme.h - what a program has by the time it comes to a block of README: the quick start's sim,
 * contact and ball, and a desc of which no model has been made yet. checks.sh quickstart compiles
 * and runs the blocks behind it; hooks that a block puts into desc then carry a sim. */
#include "clothsim_collide.h"
#include "parallel_pthreads.h"
#include <stdio.h>

typedef struct readme {
    cloth_mesh    *sheet;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *contact;
    cloth_obstacle id;
} readme;

#define README_NAMES(r)                                                                          \
    static float   positions[3 * 1024], normals[3 * 1024];                                       \
    const double   wind[3] = {1, 0, 0};                                                          \
    cloth_sim     *sim = (r)->sim;                                                               \
    cloth_collide *contact = (r)->contact;                                                       \
    cloth_obstacle id = (r)->id;                                                                 \
    cloth_desc     desc = cloth_desc_default();                                                  \
    double         left = 0, frame_time = 0.05;                                                  \
    cloth_status   status = CLOTH_OK;                                                            \
    cloth_desc_set_mesh(&desc, (r)->sheet);                                                      \
    (void)positions, (void)normals, (void)wind, (void)sim, (void)contact, (void)id, (void)left,  \
        (void)frame_time;

static int readme_blocks_held;

static void *my_alloc(size_t size, void *user) {
    (void)user;
    readme_blocks_held++;
    return malloc(size);
}

static void my_free(void *ptr, size_t size, void *user) {
    (void)size, (void)user;
    readme_blocks_held--;
    free(ptr);
}

/* What the block's hooks are good for: a sim of them steps, returns its memory, and has the bits of
 * a sim without hooks. */
static int readme_end_block(const cloth_desc *hooked) {
    cloth_desc   desc = *hooked;
    uint64_t     hash[2] = {0, 1};
    cloth_status status = CLOTH_OK;
    int          i, most = 0;
    if (!desc.hooks.parallel.run && !desc.hooks.allocator.alloc) return 0;
    for (i = 0; i < 2 && !status; i++) {
        cloth_model *model = NULL;
        cloth_sim   *sim = NULL;
        status = cloth_model_create(&desc, &model);
        if (!status) status = cloth_sim_create(model, &sim);
        if (!status) status = cloth_step(sim, 1.0 / 60, NULL);
        most += readme_blocks_held;
        if (!status) hash[i] = cloth_sim_hash(sim);
        cloth_sim_destroy(sim), cloth_model_destroy(model);
        memset(&desc.hooks, 0, sizeof desc.hooks);
    }
    return status || hash[0] != hash[1] || most < 1 || readme_blocks_held != 0;
}

static int readme_start(readme *r) {
    static const double center[3] = {0.5, -0.4, 0.5};
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_status        status;
    memset(r, 0, sizeof *r);
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, 16, 16, 1.0, 1.0, &r->sheet);
    if (status) return status;
    cloth_desc_set_mesh(&desc, r->sheet);
    desc.hooks.log.fn = cloth_log_stderr;
    desc.contact = CLOTH_CONTACT_SELF;
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = 0.3;
    status = cloth_model_create(&desc, &r->model);
    if (!status) status = cloth_sim_create(r->model, &r->sim);
    if (!status) status = cloth_collide_create(r->sim, NULL, &r->contact);
    if (!status) status = cloth_collide_add(r->contact, &ball, &r->id);
    return status;
}

static void readme_end(readme *r) {
    cloth_collide_destroy(r->contact), cloth_sim_destroy(r->sim);
    cloth_model_destroy(r->model), cloth_mesh_destroy(NULL, r->sheet);
}
