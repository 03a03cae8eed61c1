/* edges.h - how far the edges of a cloth are stretched.
 *   cloth_desc d;  const double longest = edges_longest(&d, cloth_sim_state(sim)->x);
 * Include after clothsim.h, in one .c file per program. */
#ifndef CLOTH_TEST_EDGES_H
#define CLOTH_TEST_EDGES_H

#include <math.h>

/* Largest length of an edge at x [nv x 3] over that in d->x_rest. */
static inline double edges_longest(const cloth_desc *d, const double *x) {
    const double *X = d->x_rest;
    double        most = 0;
    int           i, k;
    for (i = 0; i < 3 * d->nf; i++) {
        const int p = d->faces[i], q = d->faces[i % 3 == 2 ? i - 2 : i + 1];
        double    now = 0, rest = 0;
        for (k = 0; k < 3; k++) {
            now += (x[3 * p + k] - x[3 * q + k]) * (x[3 * p + k] - x[3 * q + k]);
            rest += (X[3 * p + k] - X[3 * q + k]) * (X[3 * p + k] - X[3 * q + k]);
        }
        most = fmax(most, sqrt(now / rest));
    }
    return most;
}

#endif
