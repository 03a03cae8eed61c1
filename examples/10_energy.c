/* 10_energy.c - where the energy of a falling sheet goes: the ledger of three integrators.
 *
 * A sheet, pinned at two corners, is let go from the horizontal. Gravity's energy becomes motion,
 * stretch and a little bending. Without air, material damping or moving pins the sum should stay;
 * what does not is the integrator's own loss. Implicit Euler takes (h omega)^2 of the energy of a
 * mode omega each step, nearly all of the fast ones: that is why its cloth looks calm. BDF2
 * takes a share of order (h omega)^4. Leapfrog takes nothing: its error swings about zero.
 *
 * Notice: report.energy. Work and loss are those of one step: add them up yourself. The numerical
 * loss is what balances the rest: change of total = work - damping - numerical loss. [2.3]
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 10_energy.c -lm
 *   page: out/10_energy.svg
 *   expected: loss after 2 s: Euler more than half of the fall, BDF2 less, leapfrog under 1 %
 *
 * Exercises: (1) STEPS 240: Euler's loss at 0.5 s falls 2.4 times, BDF2's 6.7 times. (2)
 * desc.material.damping = 0.003 (s): the damping column ends at 0.21 J under leapfrog, 0.03 J under
 * BDF2, 0.006 J under Euler: the integrator has eaten what the material would. (3) desc.wind_on = 1
 * in still air: the sheet parachutes, and the air's work is -0.9 to -1 J, most of the fall's.
 */
#include "clothsim.h"
#include "plot.h"

#define NX    14
#define STEPS 60                    /* a second                                             */
#define END   2.0                   /* s                                                    */

/* One run. Prints the ledger every half second; returns the numerical loss over what gravity gave
 * at most, or NaN when a call failed. */
static double run(plot *p, cloth_integrator integrator, const char *name, double h) {
    const int    line = plot_series(p, name);
    cloth_pin    pins[2] = {{0, CLOTH_AXIS_ALL}, {NX - 1, CLOTH_AXIS_ALL}};
    cloth_desc   desc = cloth_desc_default();
    cloth_mesh  *mesh = NULL;
    cloth_model *model = NULL;
    cloth_sim   *sim = NULL;
    cloth_ledger first;
    cloth_report r;
    double       loss = 0, damping = 0, work = 0, fall = 0, result = (double)NAN;
    int          step, steps = (int)(END / h + 0.5), half = (int)(0.5 / h + 0.5);
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, NX, NX, 1.0, 1.0, &mesh)) goto done;
    desc.nv = mesh->nv, desc.x_rest = mesh->x, desc.nf = mesh->nf, desc.faces = mesh->faces;
    desc.npins = 2, desc.pins = pins;
    desc.material.density = 0.2, desc.material.membrane = 200, desc.material.bending = 1e-4;
    desc.integrator = integrator;
    desc.tolerance = 1e-6;
    if (cloth_model_create(&desc, &model) || cloth_sim_create(model, &sim)) goto done;
    if (cloth_sim_energy(sim, &first)) goto done;
    printf("%s, steps of %.4f s\n    t s  kinetic  stretch     bend  gravity    total   damping "
           "numerical  work (J)\n", name, h);
    for (step = 1; step <= steps; step++) {
        if (cloth_step(sim, h, &r)) goto done;
        loss += r.energy.numerical_loss;
        damping += r.energy.damping_loss;
        work += r.energy.wind_work + r.energy.force_work + r.energy.pin_work;
        fall = fmax(fall, first.gravity - r.energy.gravity);
        plot_point(p, line, step * h, r.energy.total - first.total, NULL);
        if (step % half == 0)
            printf("  %5.2f %8.4f %8.4f %8.4f %8.4f %8.4f  %8.4f  %8.4f  %8.4f\n", step * h,
                   r.energy.kinetic, r.energy.stretch, r.energy.bend,
                   r.energy.gravity - first.gravity, r.energy.total - first.gravity, damping,
                   loss, work);
    }
    printf("  gravity gave %.3f J at most; the integrator lost %.3f J of it\n\n", fall, loss);
    result = loss / fall;
done:
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(NULL, mesh);
    return result;
}

int main(void) {
    plot *p = plot_open("Total energy of a falling sheet that hangs from two corners", "time (s)",
                        "energy less that at the start (J)");
    const double euler = run(p, CLOTH_INTEGRATOR_EULER, "implicit Euler", 1.0 / STEPS);
    const double bdf2 = run(p, CLOTH_INTEGRATOR_BDF2, "BDF2", 1.0 / STEPS);
    const double leap = run(p, CLOTH_INTEGRATOR_LEAPFROG, "leapfrog in substeps", 1.0 / STEPS);
    const char  *error = plot_close(p, "out/10_energy.svg");
    if (error) return fprintf(stderr, "out/10_energy.svg: %s\n", error), 1;
    printf("loss after %g s: Euler %s half of the fall, BDF2 %s, leapfrog %s 1 %%\n", END,
           euler > 0.5 ? "more than" : "NOT", bdf2 < euler ? "less" : "NOT less",
           fabs(leap) < 0.01 ? "under" : "NOT under");
    return 0;
}
