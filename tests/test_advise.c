/* test_advise.c - the groups of cloth_advise against numbers computed by hand and against the
 * modes that LEAPFROG finds; the rungs at both ends; nonsense is refused.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. test_advise.c -o test_advise \
 *      -lm && ./test_advise */
#include "clothsim.h"
#include "test.h"
#include "scene.h"

static host        told;
static cloth_hooks hooks;
static scene       S;

/* Two right triangles of a unit square: area 1/2 each, the equilateral triangle of that area has
 * the edge sqrt(2/sqrt 3) = 1.0745699318. 0.2 kg/m^2, Y = 200 N/m (plane stress), D = 1e-3 N m. */
static cloth_desc square(void) {
    static const double x[12] = {0, 0, 0, 1, 0, 0, 0, 0, -1, 1, 0, -1};
    static const int    f[6] = {0, 1, 2, 1, 3, 2};
    cloth_desc          d = cloth_desc_default();
    d.nv = 4;
    d.nf = 2;
    d.x_rest = x;
    d.faces = f;
    d.material.density = 0.2;
    d.material.membrane = 200;
    d.material.poisson = 0.3;
    d.material.bending = 1e-3;
    d.gravity[1] = -10;
    return d;
}

static void by_hand(void) {
    cloth_desc   d = square();
    cloth_advice a;
    CHECK(cloth_advise(&d, 0.01, 1e-3, &a) == CLOTH_OK);
    CHECK_REL(a.gravity_bending, 2000.0, 1e-12);            /* 0.2 * 10 * 1 / 1e-3 */
    CHECK_REL(a.step_membrane, 0.83235829006, 1e-9);        /* 0.01 * 2 sqrt(2000) / e */
    CHECK_REL(a.step_bending, 0.0056568542495, 1e-9);       /* 0.01 * 8 sqrt(0.005) / 1 */
    CHECK_REL(a.self_reach, 0.041617914503, 1e-9);          /* sqrt(20) * 0.01 / e */
    CHECK_REL(a.euler_loss, 1e-3, 1e-12);                   /* (0.01 sqrt 10)^2 */
    CHECK(a.leapfrog_substeps == 1);                        /* 0.83 / 2 / 0.8 */
    CHECK(a.membrane == CLOTH_MEMBRANE_STVK && a.bend == CLOTH_BEND_HINGE);
    CHECK(a.integrator == CLOTH_INTEGRATOR_LEAPFROG && a.contact == CLOTH_CONTACT_NONE);
    CHECK_REL(a.h, 0.01, 1e-12);
    d.material.membrane = 2e8;                              /* a thousand times the frequency */
    CHECK(cloth_advise(&d, 0.01, 1e-3, &a) == CLOTH_OK);
    CHECK(a.leapfrog_substeps == 521);                      /* ceil(832.36 / 2 / 0.8) */
    CHECK(a.integrator == CLOTH_INTEGRATOR_BDF2);
    CHECK(cloth_advise(&d, 0.01, 0.05, &a) == CLOTH_OK);
    CHECK(a.integrator == CLOTH_INTEGRATOR_EULER && a.membrane == CLOTH_MEMBRANE_SPRINGS);
    d.material.damping = 1e-5;                              /* z = 0.4162 */
    CHECK(cloth_advise(&d, 0.01, 1e-3, &a) == CLOTH_OK);
    CHECK(a.leapfrog_substeps == 780);                      /* ceil(520.2 (1.0831 + 0.4162)) */
    d.material.bending = 0;
    CHECK(cloth_advise(&d, 0.01, 1e-3, &a) == CLOTH_OK && a.bend == CLOTH_BEND_NONE);
    d.gravity[1] = 0;
    CHECK(cloth_advise(&d, 0.01, 1e-3, &a) == CLOTH_OK && isfinite(a.h) && a.h > 0);
}

/* Each bound between two rungs, from either side by 2 %. */
static void bounds(void) {
    cloth_desc   d = square();
    cloth_advice a;
    int          above;
    for (above = 0; above < 2; above++) {
        const double by = above ? 1.02 : 0.98;
        d = square();
        CHECK(cloth_advise(&d, 0.01, 0.02 * by, &a) == CLOTH_OK);
        CHECK(a.membrane == (above ? CLOTH_MEMBRANE_SPRINGS : CLOTH_MEMBRANE_STVK));
        CHECK(cloth_advise(&d, 0.01, 0.01 * by, &a) == CLOTH_OK && a.bend == CLOTH_BEND_HINGE);
        d.rest_angle = CLOTH_REST_ANGLE_FLAT;
        CHECK(cloth_advise(&d, 0.01, 0.01 * by, &a) == CLOTH_OK);
        CHECK(a.bend == (above ? CLOTH_BEND_QUADRATIC : CLOTH_BEND_HINGE));
        d.material.bending = 2e-9 * by * by * by;           /* (rho g L^3/D)^(-1/3) = 1e-3 by */
        CHECK(cloth_advise(&d, 0.01, 0.01, &a) == CLOTH_OK);
        CHECK(a.bend == (above ? CLOTH_BEND_HINGE : CLOTH_BEND_NONE));
        d = square();                                       /* h omega_m / 2 = 80 by */
        CHECK(cloth_advise(&d, 0.01 * 160 / 0.83235829006 * by, 0.01, &a) == CLOTH_OK);
        CHECK(a.leapfrog_substeps == (above ? 102 : 98));
        CHECK(a.integrator == (above ? CLOTH_INTEGRATOR_BDF2 : CLOTH_INTEGRATOR_LEAPFROG));
        d.material.membrane = 2e8;                          /* h sqrt(g L) / 2 */
        CHECK(cloth_advise(&d, 0.01, 0.005 * sqrt(10.0) * by, &a) == CLOTH_OK);
        CHECK(a.integrator == (above ? CLOTH_INTEGRATOR_EULER : CLOTH_INTEGRATOR_BDF2));
        CHECK(cloth_advise(&d, 0.1, 4e-3 * by * by, &a) == CLOTH_OK);
        CHECK_REL(a.h, 0.02 * by, 1e-12);                   /* sqrt(tolerance/L)/sqrt(g/L) */
    }
}

/* The numbers are those of the stiffest region, wherever it is in the list. */
static void stiffest_region(void) {
    static const double x[12] = {0, 0, 0, 1, 0, 0, 0, 0, -1, 1, 0, -1};
    static const int    f[6] = {0, 1, 2, 1, 3, 2}, region[2] = {0, 1};
    cloth_desc          d = cloth_desc_default();
    cloth_material      two[2];
    cloth_advice        a;
    int                 k;
    d.nv = 4, d.nf = 2, d.x_rest = x, d.faces = f, d.region = region;
    d.nregions = 2, d.materials = two;
    d.gravity[1] = -10;
    for (k = 0; k < 2; k++) {
        two[0] = two[1] = cloth_material_default();
        two[k].bending = 1e-3, two[1 - k].bending = 1e-6;
        two[k].membrane = 200, two[1 - k].membrane = 50;
        CHECK(cloth_advise(&d, 0.01, 1e-3, &a) == CLOTH_OK);
        CHECK_REL(a.gravity_bending, 2000.0, 1e-12);        /* as in by_hand */
        CHECK_REL(a.step_bending, 0.0056568542495, 1e-9);
        CHECK_REL(a.step_membrane, 0.83235829006, 1e-9);
    }
}

/* The frequencies that it estimates are those that LEAPFROG's power method finds. */
static void against_modes(void) {
    cloth_report r;
    cloth_advice a;
    int          k;
    for (k = 0; k < 2; k++) {
        double ratio;
        scene_desc(&S, 8, NULL, 0);
        S.desc.integrator = CLOTH_INTEGRATOR_LEAPFROG;
        if (k == 1) {                       /* bending rules */
            S.desc.material.membrane = 1;
            S.desc.material.bending = 10;
        }
        CHECK(scene_open(&S, 0) == CLOTH_OK && cloth_step(S.sim, 1e-4, &r) == CLOTH_OK);
        CHECK(cloth_advise(&S.desc, 1.0, 1e-3, &a) == CLOTH_OK);
        ratio = (k ? a.step_bending : a.step_membrane) / r.omega_max;
        printf("  %s: estimate over found %.2f\n", k ? "bending" : "membrane", ratio);
        CHECK(ratio > 0.5 && ratio < 2);
        scene_close(&S);
    }
}

/* The substeps that LEAPFROG really takes, within a factor of 3: of a stiff region that is not the
 * first, of a pattern smaller than the template, of damping. */
static void against_substeps(void) {
    int k, i;
    for (k = 0; k < 3; k++) {
        static int     region[200];
        static double  X[1200];
        cloth_material two[2];
        cloth_report   r;
        cloth_advice   a;
        scene_desc(&S, 8, NULL, 0);
        S.desc.integrator = CLOTH_INTEGRATOR_LEAPFROG;
        two[0] = two[1] = S.desc.material;
        two[1].membrane *= k == 0 ? 1e4 : 1;
        two[1].damping = k == 2 ? 0.05 : 0;
        for (i = 0; i < S.desc.nf; i++) region[i] = i > 0;
        for (i = 0; i < 6 * S.desc.nf; i++) X[i] = 0.1 * S.mesh->X[i];
        for (i = 0; i < 3 * S.nv; i++) S.mesh->x[i] *= k == 1 ? 0.1 : 1;
        S.desc.region = region, S.desc.nregions = 2, S.desc.materials = two;
        if (k == 1) S.desc.X = X;
        CHECK(scene_open(&S, 0) == CLOTH_OK && cloth_step(S.sim, 0.1, &r) == CLOTH_OK);
        for (i = 0; i < 3 * S.nv; i++) S.mesh->x[i] *= k == 1 ? 10 : 1;
        CHECK(cloth_advise(&S.desc, 0.1, 1e-3, &a) == CLOTH_OK);
        printf("  %d substeps advised, %d taken\n", a.leapfrog_substeps, r.substeps);
        CHECK(a.leapfrog_substeps > r.substeps / 3 && a.leapfrog_substeps < 3 * r.substeps);
        scene_close(&S);
    }
}

static int refused(const cloth_desc *d, double h, double tolerance, cloth_status want) {
    cloth_advice a;
    cloth_status got;
    host_forget(&told);
    got = cloth_advise(d, h, tolerance, &a);
    return got == want && (told.errors > 0 || want == CLOTH_ERR_UNINIT) && told.live == 0;
}

static void nonsense(void) {
    cloth_advice a;
    cloth_desc   d;
    hooks = host_hooks(&told);
    scene_desc(&S, 4, &hooks, 0);
    d = S.desc;
    CHECK(cloth_advise(NULL, 1, 1, &a) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_advise(&d, 1, 1, NULL) == CLOTH_ERR_ARGUMENT && told.errors == 1);
    CHECK(refused(&d, 0, 1e-3, CLOTH_ERR_ARGUMENT) && strstr(told.text, "h = 0"));
    CHECK(refused(&d, -1, 1e-3, CLOTH_ERR_ARGUMENT));
    CHECK(refused(&d, NAN, 1e-3, CLOTH_ERR_ARGUMENT));
    CHECK(refused(&d, 0.01, 0, CLOTH_ERR_ARGUMENT));
    CHECK(refused(&d, 0.01, INFINITY, CLOTH_ERR_ARGUMENT));
    d.material.density = 0;
    CHECK(refused(&d, 0.01, 1e-3, CLOTH_ERR_ARGUMENT) && strstr(told.text, "density"));
    d = S.desc;
    d.nf = 0;
    CHECK(refused(&d, 0.01, 1e-3, CLOTH_ERR_ARGUMENT) && strstr(told.text, "nf"));
    d = S.desc;
    d.cookie = 0;
    CHECK(refused(&d, 0.01, 1e-3, CLOTH_ERR_UNINIT));
    CHECK(cloth_advise(&S.desc, 0.01, 1e-3, &a) == CLOTH_OK && told.live == 0);
    scene_close(&S);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(by_hand);
    RUN(bounds);
    RUN(stiffest_region);
    RUN(against_modes);
    RUN(against_substeps);
    RUN(nonsense);
    return TEST_END();
}
