/* leapfrog_contact.c - the explicit rung with contact gains no energy, whatever its substeps.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. \
 *      stability/leapfrog_contact.c -lm
 * tier: default
 *
 *   obstacle  a sheet of 0.6 m falls 5 cm onto a sphere and a plane, contact with obstacles alone
 *   self      a sheet of 0.4 m stands on its side and falls onto a plane, contact with itself too
 *
 * Both for frames of 1/60, 1/240 and 1/960 s, which are many substeps or few. The things are at
 * rest: kinetic energy and potential (of a twin without contact) never exceed those of the start
 * by more than 1 % of the weight times the sheet's side; at that much itself a run ends. A step
 * that is refused by name (CLOTH_ERR_UNSUPPORTED) is an answer; one that fails is not. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "../shapes.h"
#include "../exact.h"
#include "../stage.h"

typedef struct fall {
    double gain, size;                      /* J: most over the start; weight times side       */
    int    steps, failed, refused, substeps;
} fall;

static fall drop(int self, int n, double h, double seconds) {
    const double side = self ? 0.4 : 0.6;
    fall         out = {0, 0, 0, 0, 0, 0};
    stage        s;
    double       start;
    int          i;
    stage_sheet(&s, n, side);
    if (self) stage_upright(&s);
    s.desc.integrator = CLOTH_INTEGRATOR_LEAPFROG;
    s.desc.contact = self ? CLOTH_CONTACT_SELF : CLOTH_CONTACT_OBSTACLES;
    s.desc.hooks.log.fn = NULL;
    if (stage_start(&s)) {
        if (!self) stage_sphere(&s, 0.3, -0.25, 0.3, 0.2);
        stage_plane(&s, self ? 0 : -0.5, 0.3);
        start = stage_energy(&s);
        out.size = 0.2 * side * side * 9.81 * side;
        for (i = 0; i < seconds / h - 1e-6; i++) {
            cloth_report       r;
            const cloth_status status = cloth_step(s.sim, h, &r);
            double             e;
            out.refused += status == CLOTH_ERR_UNSUPPORTED;
            if (out.refused) break;
            out.steps++;
            out.failed += status != CLOTH_OK;
            out.substeps = r.substeps > out.substeps ? r.substeps : out.substeps;
            e = stage_energy(&s) - start;
            out.gain = e <= out.gain ? out.gain : e;
            if (!(out.gain < out.size)) break;
        }
    }
    stage_end(&s);
    return out;
}

static void falls(int self) {
    static const double per[] = {60, 240, 960};
    const double        seconds = test_full() ? 2 : 0.6;
    double              worst = 0;
    int                 i, failed = 0;
    printf("     1/h  substeps   steps failed refused   gain J  of weight x side\n");
    for (i = 0; i < 3; i++) {
        const fall f = drop(self, test_full() ? 24 : 12, 1 / per[i], seconds);
        printf("    %4.0f %9d %7d %6d %7s %8.3g  %8.3g\n", per[i], f.substeps, f.steps, f.failed,
               f.refused ? "yes" : "no", f.gain, f.gain / f.size);
        fflush(stdout);
        worst = fmax(worst, f.gain / f.size);
        failed += f.failed;
    }
    CHECK(worst <= 0.01);                   /* energy gained */
    CHECK(failed == 0);
}

static void obstacle(void) { falls(0); }
static void self(void) { falls(1); }

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(obstacle);
    RUN(self);
    return TEST_END();
}
