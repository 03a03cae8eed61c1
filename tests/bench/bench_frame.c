/* bench_frame.c - how many vertices at 60 Hz: a curtain that a ball walks into, ms of CPU a step of
 * 1/60 s by size, rung and contact. The table of README comes from here.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. bench/bench_frame.c -lm
 * Rows: 'converged' is the default, tolerance 1e-4 m; '2 iterations' sets max_newton = 2; both
 * implicit Euler. Each figure is the median of steps 10 to 50, in which the ball goes through the
 * curtain's plane and pushes it. */
#include "../test.h"
#include "clothsim_collide.h"

#define STEPS 50

static int less(const void *a, const void *b) {
    const double d = *(const double *)a - *(const double *)b;
    return d < 0 ? -1 : d > 0;
}

/* Median ms a step; failed counts steps that were refused. */
static double frame(int n, int newton, cloth_contact_rung rung, int *failed) {
    double              ms[STEPS], center[3] = {0.5, 0.5, 0.25};
    cloth_mesh         *sheet = NULL;
    cloth_model        *model = NULL;
    cloth_sim          *sim = NULL;
    cloth_collide      *contact = NULL;
    cloth_desc          desc = cloth_desc_default();
    cloth_obstacle_desc ball = cloth_obstacle_desc_default();
    cloth_obstacle      id;
    cloth_pin           pins[2] = {{0, CLOTH_AXIS_ALL}, {n - 1, CLOTH_AXIS_ALL}};
    cloth_status        status;
    status = cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, 1.0, 1.0, &sheet);
    if (status) return -1;
    for (int i = 0; i < sheet->nv; i++)         /* upright */
        sheet->x[3 * i + 1] = 1 - sheet->x[3 * i + 2], sheet->x[3 * i + 2] = 0;
    cloth_desc_set_mesh(&desc, sheet);
    desc.npins = 2, desc.pins = pins;
    desc.contact = rung, desc.max_newton = newton;
    desc.material.membrane = 500;
    ball.kind = CLOTH_OBSTACLE_SPHERE, ball.x = center, ball.radius = 0.2;
    status = cloth_model_create(&desc, &model);
    if (!status) status = cloth_sim_create(model, &sim);
    if (!status && rung != CLOTH_CONTACT_NONE) status = cloth_collide_create(sim, NULL, &contact);
    if (!status && contact) status = cloth_collide_add(contact, &ball, &id);
    for (int i = 0; i < STEPS && !status; i++) {
        const clock_t begin = clock();
        center[2] -= 0.012;
        if (contact) status = cloth_collide_move(contact, id, center);
        *failed += cloth_step(sim, 1.0 / 60, NULL) != CLOTH_OK;
        ms[i] = 1e3 * (double)(clock() - begin) / CLOCKS_PER_SEC;
    }
    cloth_collide_destroy(contact), cloth_sim_destroy(sim), cloth_model_destroy(model);
    cloth_mesh_destroy(NULL, sheet);
    if (status) return -1;
    qsort(ms + 10, STEPS - 10, sizeof *ms, less);
    return ms[10 + (STEPS - 10) / 2];
}

static void table(void) {
    static const int  side[5] = {10, 20, 30, 45, 64};
    static const int  newton[2] = {0, 2};
    cloth_contact_rung rung[3] = {CLOTH_CONTACT_NONE, CLOTH_CONTACT_OBSTACLES, CLOTH_CONTACT_SELF};
    int               failed = 0;
    printf("| vertices | solved | no contact | with the ball | and with itself |\n");
    printf("|---|---|---|---|---|\n");
    for (int s = 0; s < (test_full() ? 5 : 4); s++)
        for (int k = 0; k < 2; k++) {
            printf("| %d | %s |", side[s] * side[s], newton[k] ? "2 iterations" : "converged");
            for (int r = 0; r < 3; r++) {
                const double ms = frame(side[s], newton[k], rung[r], &failed);
                CHECK(ms > 0);
                printf(ms < 9.95 ? " %.1f ms |" : " %.0f ms |", ms);
            }
            printf("\n");
            fflush(stdout);
        }
    printf("  steps that failed: %d\n", failed);
    CHECK(failed == 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(table);
    return TEST_END();
}
