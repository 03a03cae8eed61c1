/* 17_elastica.c - a student's elastica: a strip clamped level bends by its weight, as in the book.
 *
 *   theta'' = -G (1 - s) cos theta,  theta(0) = 0,  theta'(1) = 0,   G = rho g L^3 / D = 10
 *
 * The book's tip is at x = 0.65635, y = -0.70020 of the length. Four strips of 40 segments come
 * nearer and nearer to it; notice what each of three things is worth:
 *   clamp   a level end is two rows of pinned vertices: one row holds places, no slope. The hinge
 *           in the clamped row stands for half a segment only, so its stiffness is doubled
 *           (params.hinge_scale = 2); without that the error is of order one in the segment
 *   ties    the book's beam bends as a cylinder: its rows stay straight. A free strip does not:
 *           hinges have a Poisson's ratio of -1/3 in bending, so it curls across as well, which
 *           makes it softer: 1 - (1/3)^2 = 8/9 of D for a narrow strip of equilateral triangles,
 *           and another part of it on this mesh. cloth_tie makes each row move as one
 *   stages  the book's strip cannot stretch. Newton turns a stiff segment little by little, so the
 *           membrane is stiffened step by step, each from the equilibrium of the one before
 * tests/validate/elastica.c goes on from here: order of convergence, loads up to 100, free sheets.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. 17_elastica.c -lm
 *   expected: clamp, ties and half hinge: the tip is within 1 % of the book's: yes
 *
 * Exercises: (1) SEGMENTS 10 and 20: the last error falls by four, the one before by two; (2)
 * WEIGHT 1: which of the three matters least for a strip that hardly bends? Compare with the last
 * row there: the book's numbers are of 10. */
#include "clothsim.h"
#include <math.h>
#include <stdio.h>

#define SEGMENTS 40
#define WEIGHT   10.0                       /* G                                  */
#define BOOK_X   0.6563537612
#define BOOK_Y   (-0.7001997155)

enum { CLAMP = 1, TIES = 2, HALF = 4 };

/* Column i of the strip is at x = (i - 1)/SEGMENTS; three rows along it, the first one leads. All
 * of a tied strip stays in its rows' planes, of a free one the middle row. */
static void hold(cloth_desc *desc, int nv, int how, cloth_pin *pin, cloth_tie *tie) {
    const int nx = SEGMENTS + 2;
    desc->pins = pin, desc->ties = tie;
    for (int i = 0; i < nv; i++) {
        const int held = i % nx <= (how & CLAMP ? 1 : 0), planar = how & TIES || i / nx == 1;
        if (held || planar) {
            pin[desc->npins].vertex = i;
            pin[desc->npins++].axes = held ? CLOTH_AXIS_ALL : CLOTH_AXIS_Z;
        }
        if (held || i < nx || !(how & TIES)) continue;
        tie[desc->nties].leader = i % nx, tie[desc->nties].follower = i;
        tie[desc->nties++].axes = CLOTH_AXIS_X | CLOTH_AXIS_Y;
    }
}

/* Where the tip comes to rest. */
static cloth_status tip(int how, double *x, double *y) {
    const int        nx = SEGMENTS + 2;
    cloth_pin        pin[3 * (SEGMENTS + 2)];
    cloth_tie        tie[3 * (SEGMENTS + 2)];
    cloth_mesh      *m = NULL;
    cloth_model     *model = NULL;
    cloth_sim       *sim = NULL;
    cloth_desc       desc = cloth_desc_default();
    cloth_status     status;
    desc.hooks.log.fn = cloth_log_stderr;
    status = cloth_mesh_sheet(&desc.hooks, CLOTH_SHEET_ALTERNATING, nx, 3, 1 + 1.0 / SEGMENTS,
                              2.0 / SEGMENTS, &m);
    if (status) return status;
    cloth_desc_set_mesh(&desc, m);
    desc.material.density = 1, desc.material.bending = 1, desc.material.poisson = 0;
    desc.material.membrane = 1e3;
    desc.gravity[1] = -WEIGHT, desc.tolerance = 1e-8;
    hold(&desc, m->nv, how, pin, tie);
    status = cloth_model_create(&desc, &model);
    if (!status) status = cloth_sim_create(model, &sim);
    if (!status && how & HALF) {
        const cloth_topology *t = cloth_model_topology(model);
        cloth_params         *p = cloth_sim_params(sim);
        for (int k = 0; k < t->nh && p; k++)
            if (t->hinges[4 * k] % nx == 1 && t->hinges[4 * k + 1] % nx == 1) p->hinge_scale[k] = 2;
        status = cloth_sim_params_changed(sim);
    }
    for (double stiff = 1e3; stiff < 1e8 && !status; stiff *= 100) {
        desc.material.membrane = stiff;
        status = cloth_sim_set_material(sim, 0, &desc.material);
        if (!status) status = cloth_solve_static(sim, NULL);
    }
    if (!status) {
        const double *end = cloth_sim_state(sim)->x + 3 * (2 * nx - 1);     /* of the middle row */
        *x = end[0] - 1.0 / SEGMENTS, *y = end[1];
    }
    cloth_sim_destroy(sim), cloth_model_destroy(model), cloth_mesh_destroy(&desc.hooks, m);
    return status;
}

int main(void) {
    static const int         how[4] = {0, CLAMP, CLAMP | TIES, CLAMP | TIES | HALF};
    static const char *const name[4] = {"one row pinned, free to curl", "clamp: two rows",
                                        "clamp and ties", "clamp, ties and half hinge"};
    double x = 0, y = 0, error = 1;
    printf("%-30s %10s %10s %10s\n", "", "x", "y", "error");
    printf("%-30s %10.5f %10.5f\n", "the book", BOOK_X, BOOK_Y);
    for (int k = 0; k < 4; k++) {
        const cloth_status status = tip(how[k], &x, &y);
        if (status) return printf("%s: %s\n", name[k], cloth_status_text(status)), 1;
        error = hypot(x - BOOK_X, y - BOOK_Y);
        printf("%-30s %10.5f %10.5f %8.2f %%\n", name[k], x, y, 100 * error);
    }
    printf("clamp, ties and half hinge: the tip is within 1 %% of the book's: %s\n",
           error < 0.01 ? "yes" : "no");
    return 0;
}
