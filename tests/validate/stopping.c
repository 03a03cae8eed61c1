/* stopping.c - a sheet that slides on a plane stops where Coulomb's law says, and stays there.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. validate/stopping.c -lm
 *
 *   v_k = v0 - k mu g h > 0,  distance sum v_k h: implicit Euler's of v0^2 / (2 mu g)
 *
 * The sheet lies still under gravity for 0.5 s, then gets its speed. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "friction.h"

typedef struct stop {
    double way, back;                       /* m; largest way against the motion in a step     */
    double late;                            /* m, gone after the time of the stop + 0.1 s      */
} stop;

static stop slide(double mu, double v0, double h) {
    stop   out = {NAN, 0, NAN};
    double x0, before, now, then = 0;
    fric   s;
    int    i, n = (int)(v0 / (mu * FRIC_G * h)) + 1;
    fric_sheet(&s, 5, 5, 0.1, 0.1);
    fric_place(&s, 0, 0, FRIC_T / 2, 0);
    if (!fric_start(&s) || !CHECK(fric_ground(&s, 0, mu, 0, 0) == CLOTH_OK)) goto done;
    for (i = 0; i < 0.5 / h; i++) CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
    for (i = 0; i < s.nv; i++) cloth_sim_state(s.sim)->v[3 * i] = v0;
    x0 = before = fric_mean(&s, cloth_sim_state(s.sim)->x, 0);
    for (i = 0; i < n + 0.6 / h; i++) {
        CHECK(cloth_step(s.sim, h, NULL) == CLOTH_OK);
        now = fric_mean(&s, cloth_sim_state(s.sim)->x, 0);
        out.back = fmax(out.back, before - now);
        before = now;
        if (i < n + 0.1 / h) then = now;
    }
    out.way = before - x0;
    out.late = before - then;
done:
    fric_end(&s);
    return out;
}

static void distance(void) {
    static const double mu[] = {0.1, 0.3, 1}, v0[] = {1, 3};
    const double        h = 1.0 / 240;
    int                 i, k, n;
    printf("   mu  v0   way m     implicit Euler  error %%   v0^2/(2 mu g)  back m   late m\n");
    for (i = 0; i < 3; i++)
        for (k = 0; k < 2; k++) {
            const stop   s = slide(mu[i], v0[k], h);
            const double exact = v0[k] * v0[k] / (2 * mu[i] * FRIC_G);
            double       ref = 0, v;
            for (n = 1; (v = v0[k] - n * mu[i] * FRIC_G * h) > 0; n++) ref += v * h;
            printf("  %4.1f %3.0f  %9.6f %12.6f  %9.3f %12.6f  %9.1e %9.1e\n", mu[i], v0[k], s.way,
                   ref, 100 * (s.way / ref - 1), exact, s.back, s.late);
            CHECK(fabs(s.way / ref - 1) < 0.01);
            CHECK(s.back < 2e-5);           /* the anchor's give, desc.slip */
            CHECK(fabs(s.late) < 2e-5);
        }
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(distance);
    return TEST_END();
}
