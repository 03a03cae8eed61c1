/* grad_host.h - an energy term of a host with a parameter, for the tests of gradients. Include
 * behind clothsim_grad.h. */
#ifndef CLOTH_GRAD_HOST_H
#define CLOTH_GRAD_HOST_H

typedef struct swarm {                      /* E = k/4 sum |x - c|^4 N/m^3                      */
    double k, c[3], dk;
} swarm;

static inline cloth_status swarm_eval(void *user, const cloth_eval *e, double *energy) {
    const swarm *u = (const swarm *)user;
    cloth_status status = CLOTH_OK;
    int          i, j;
    *energy = 0;
    for (i = 0; i < e->nv && !status; i++) {
        double d[3], H[9], d2 = 0;
        for (j = 0; j < 3; j++) d[j] = e->x[3 * i + j] - u->c[j], d2 += d[j] * d[j];
        *energy += 0.25 * u->k * d2 * d2;
        for (j = 0; j < 3; j++)
            if (e->grad) e->grad[3 * i + j] += u->k * d2 * d[j];
        for (j = 0; j < 9; j++) H[j] = u->k * (2 * d[j / 3] * d[j % 3] + (j % 4 == 0) * d2);
        if (e->hess) status = cloth_matrix_add_element(e->hess, 1, &i, H);
    }
    return status;
}

static inline cloth_status swarm_vjp(void *user, const cloth_eval *e, const double *a,
                                     cloth_vjp *out) {
    swarm *u = (swarm *)user;
    int    i, j;
    for (i = 0; i < e->nv && out->own; i++) {
        double d[3], d2 = 0, ad = 0;
        for (j = 0; j < 3; j++) d[j] = e->x[3 * i + j] - u->c[j], d2 += d[j] * d[j];
        for (j = 0; j < 3; j++) ad += a[3 * i + j] * d[j];
        u->dk += d2 * ad;
    }
    return CLOTH_OK;
}

static inline cloth_term swarm_term(swarm *u) {
    cloth_term term;
    memset(&term, 0, sizeof term);
    term.name = "swarm", term.user = u, term.eval = swarm_eval, term.vjp = swarm_vjp;
    return term;
}

#endif
