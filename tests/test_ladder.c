/* test_ladder.c - each rung costs nothing when it is not chosen, by the report's counters, and
 * changes the answer as it should.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_ladder.c -o test_ladder \
 *      -lm && ./test_ladder */
#include "clothsim.h"
#include "test.h"
#include "scene.h"

static scene S;

static scene make(int m, int b, int kind, int with) {
    return scene_make(6, (cloth_membrane)m, (cloth_bend_model)b, (cloth_integrator)kind, NULL,
                      with);
}

/* Sums of the counters over n steps. */
static cloth_counts steps(int n, double h, cloth_report *last) {
    cloth_counts sum;
    int          k;
    memset(&sum, 0, sizeof sum);
    for (k = 0; k < n; k++) {
        CHECK(cloth_step(S.sim, h, last) == CLOTH_OK);
        sum.triangles += last->counts.triangles;
        sum.springs += last->counts.springs;
        sum.hinges += last->counts.hinges;
        sum.hessians += last->counts.hessians;
        sum.bend_assemblies += last->counts.bend_assemblies;
        sum.wind_faces += last->counts.wind_faces;
        sum.contact_calls += last->counts.contact_calls;
    }
    return sum;
}

static void bend_none(void) {
    int          kind;
    cloth_report r, full;
    cloth_counts c;
    FOR_INTEGRATORS(kind) {
        S = make(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, WITH_PINS);
        c = steps(5, 0.005, &full);
        CHECK(c.hinges > 0);
        if (kind != CLOTH_INTEGRATOR_LEAPFROG)
            CHECK(c.bend_assemblies > 0 && cloth_model_blocks_per_row(S.model) > 8);
        scene_close(&S);
        S = make(CLOTH_MEMBRANE_STVK, CLOTH_BEND_NONE, kind, WITH_PINS | WITH_DAMPING);
        c = steps(5, 0.005, &r);
        CHECK(c.hinges == 0 && c.bend_assemblies == 0);
        CHECK(cloth_sim_params(S.sim)->nh == 0);
        CHECK(fabs(r.energy.bend) <= 0 && r.folded == 0);
        CHECK(cloth_model_blocks_per_row(S.model) <= 8);
        CHECK(r.bytes.elements < full.bytes.elements);
        if (kind != CLOTH_INTEGRATOR_LEAPFROG) CHECK(r.bytes.matrix < full.bytes.matrix);
        scene_close(&S);
    }
}

static void quadratic_once(void) {
    int          kind;
    cloth_report r;
    cloth_counts c;
    for (kind = CLOTH_INTEGRATOR_EULER; kind <= (int)CLOTH_INTEGRATOR_BDF2; kind++) {
        S = make(CLOTH_MEMBRANE_STVK, CLOTH_BEND_QUADRATIC, kind, WITH_PINS | WITH_NOISE);
        c = steps(20, 0.005, &r);
        CHECK(c.bend_assemblies == 1);
        CHECK(c.hinges > 0 && r.energy.bend > 0);
        CHECK(cloth_sim_set_material(S.sim, 0, &S.desc.material) == CLOTH_OK);
        c = steps(5, 0.005, &r);
        CHECK(c.bend_assemblies == 1);      /* once more: other numbers */
        scene_close(&S);
    }
}

static void leapfrog_has_no_matrix(void) {
    cloth_report r;
    cloth_counts c;
    S = make(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_LEAPFROG,
             WITH_ALL & ~WITH_NOISE);
    c = steps(5, 0.005, &r);
    CHECK(r.bytes.matrix == 0 && r.bytes.factor == 0);
    CHECK(c.hessians == 0 && r.linear_solves == 0 && r.cg == 0 && r.newton == 0);
    CHECK(r.omega_max > 0 && r.substeps >= (int)(0.5 * 0.005 * r.omega_max));
    CHECK(cloth_model_blocks_per_row(S.model) <= 0);
    CHECK(cloth_solve_static(S.sim, &r) == CLOTH_ERR_UNSUPPORTED);
    scene_close(&S);
}

static void no_wind_no_faces(void) {
    int          kind;
    cloth_report r;
    cloth_counts c;
    double       w[3] = {1, 0, 0};
    FOR_INTEGRATORS(kind) {
        S = make(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, WITH_PINS);
        c = steps(4, 0.005, &r);
        CHECK(c.wind_faces == 0 && c.contact_calls == 0 && r.bytes.contact == 0);
        CHECK(cloth_sim_set_wind(S.sim, w) == CLOTH_OK);
        c = steps(4, 0.005, &r);
        CHECK(c.wind_faces >= 4 * S.mesh->nf);
        CHECK(cloth_sim_set_wind(S.sim, NULL) == CLOTH_OK);
        c = steps(4, 0.005, &r);
        CHECK(c.wind_faces == 0);
        scene_close(&S);
    }
}

static void membranes(void) {
    int          m;
    cloth_report r;
    cloth_counts c;
    for (m = CLOTH_MEMBRANE_SPRINGS; m <= (int)CLOTH_MEMBRANE_STVK; m++) {
        S = make(m, CLOTH_BEND_HINGE, CLOTH_INTEGRATOR_EULER, WITH_PINS);
        c = steps(4, 0.005, &r);
        CHECK((c.triangles > 0) == (m == CLOTH_MEMBRANE_STVK));
        CHECK((c.springs > 0) == (m == CLOTH_MEMBRANE_SPRINGS));
        scene_close(&S);
    }
}

static void a_capped_newton(void) {
    cloth_report r;
    int          capped = 0, k;
    scene_desc(&S, 6, NULL, WITH_NOISE);
    S.desc.max_newton = 1;
    CHECK(scene_open(&S, WITH_PINS) == CLOTH_OK);
    for (k = 0; k < 5; k++) {
        CHECK(cloth_step(S.sim, 0.01, &r) == CLOTH_OK && r.newton <= 1);
        capped += r.outcome == CLOTH_STEP_MAX_ITERATIONS;
    }
    CHECK(capped == 5);
    scene_close(&S);
}

/* --- what the rungs differ in --- */

/* Height of the free edge of a sheet that is clamped along one side, in statics. */
static double droop(int membrane, int bend, double D) {
    cloth_report r;
    double       low = 0;
    int          i;
    scene_desc(&S, 6, NULL, 0);
    S.desc.membrane = (cloth_membrane)membrane;
    S.desc.bend = (cloth_bend_model)bend;
    S.desc.material.bending = D;
    S.desc.material.membrane = 500;
    CHECK(scene_open(&S, 0) == CLOTH_OK);
    for (i = 0; i < S.nv; i++)              /* two rows: clamped, not hinged */
        if (S.mesh->x[3 * i + 2] < 0.11) CHECK(cloth_sim_pin(S.sim, i, 7, NULL) == CLOTH_OK);
    CHECK(cloth_solve_static(S.sim, &r) == CLOTH_OK);
    for (i = 0; i < S.nv; i++) low = fmin(low, cloth_sim_state(S.sim)->x[3 * i + 1]);
    scene_close(&S);
    return low;
}

static void rungs_differ(void) {
    /* cantilever, q L^4/(8 D) with q = 0.2 * 9.81 N/m^2: 0.4 m hang over the second clamped row,
     * whose hinges bend over the half row behind it too: L = 0.45 m */
    const double stiff = droop(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, 0.5);
    const double soft = droop(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, 1e-3);
    const double quad = droop(CLOTH_MEMBRANE_STVK, CLOTH_BEND_QUADRATIC, 0.5);
    const double spring = droop(CLOTH_MEMBRANE_SPRINGS, CLOTH_BEND_HINGE, 0.5);
    const double thin = 0.2 * 9.81 * pow(0.45, 4) / (8 * 0.5);
    printf("  stiff %.4f, linear theory %.4f; quadratic %.4f, springs %.4f; soft %.3f\n", -stiff,
           thin, -quad, -spring, -soft);
    CHECK(-stiff > 0.9 * thin && -stiff < 1.1 * thin);
    CHECK_REL(quad, stiff, 0.02);           /* nearly flat: the two bendings agree */
    CHECK_REL(spring, stiff, 0.05);
    CHECK(-soft > 0.3 && -soft < 0.42);     /* hangs down */
}

/* Integrators: explicit and BDF2 agree with each other, implicit Euler damps. */
static void integrators_differ(void) {
    double       total[4], start = 0;
    int          kind, k;
    cloth_report r;
    FOR_INTEGRATORS(kind) {
        S = make(CLOTH_MEMBRANE_STVK, CLOTH_BEND_HINGE, kind, WITH_PINS);
        for (k = 0; k < 60; k++) {
            CHECK(cloth_step(S.sim, 0.002, &r) == CLOTH_OK);
            if (k == 0) start = r.energy.total;
        }
        total[kind] = r.energy.total - start;
        scene_close(&S);
    }
    printf("  energy change: leapfrog %.2e, euler %.2e, bdf2 %.2e J\n", total[1], total[2],
           total[3]);
    CHECK(fabs(total[CLOTH_INTEGRATOR_LEAPFROG]) < 0.2 * fabs(total[CLOTH_INTEGRATOR_EULER]));
    CHECK(fabs(total[CLOTH_INTEGRATOR_BDF2]) < 0.5 * fabs(total[CLOTH_INTEGRATOR_EULER]));
    CHECK(total[CLOTH_INTEGRATOR_EULER] < 0);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(bend_none);
    RUN(quadratic_once);
    RUN(leapfrog_has_no_matrix);
    RUN(no_wind_no_faces);
    RUN(membranes);
    RUN(a_capped_newton);
    RUN(rungs_differ);
    RUN(integrators_differ);
    return TEST_END();
}
