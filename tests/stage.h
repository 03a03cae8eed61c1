/* stage.h - scenes with contact, each of their steps examined by exact arithmetic.
 *   stage s; stage_sheet(&s, ...); stage_start(&s); stage_mesh(&s, ...); stage_step(&s, h); ...
 * Include after clothsim_collide.h, test.h, shapes.h and exact.h.
 *
 * After every accepted step no two triangles of the cloth and of mesh obstacles may intersect that
 * did not before (exact.h: no rounding), and the cloth must be outside of spheres, capsules and
 * planes (long double). The kit's own count, cloth_collide_intersections(),
 * must be that of exact.h, exempt pairs included. */
#ifndef CLOTH_TEST_STAGE_H
#define CLOTH_TEST_STAGE_H

#include "ccd.h"

#define STAGE_THINGS 4
#define STAGE_STEPS  1024       /* whose Newton counts are kept                                */

typedef struct stage_thing {                /* an obstacle as this file knows it               */
    cloth_obstacle      id;
    cloth_obstacle_kind kind;
    int                 nv, nf, first;      /* first: of its faces, in the list                */
    double             *x;                  /* [nv x 3] where it is                            */
    double             *next;               /* [nv x 3] where the next step ends               */
    double              radius, normal[3];
} stage_thing;

typedef struct stage {
    cloth_mesh         *mesh;
    cloth_desc          desc;
    cloth_collide_desc  contact;
    cloth_model        *model;
    cloth_sim          *sim;
    cloth_collide      *c;
    cloth_state        *state;
    cloth_model        *plain;              /* the same cloth, which knows of no contact       */
    cloth_sim          *still;
    stage_thing         thing[STAGE_THINGS];
    int                 nthing;
    int                 nv, nf;             /* cloth and meshes                                */
    double             *x;                  /* [nv x 3]                                        */
    int                *faces;              /* [nf x 3]                                        */
    int                *pair, npair, pair_room;     /* that intersect now                      */

    /* what came of it */
    int         steps, whole, shorter, failed;
    int         new_pairs, inside, first_bad;
    int         miscounted;                 /* steps whose crossings the kit counts otherwise  */
    int         passes, zones, rows, zone, rigid;   /* the most in a step; rigid: all          */
    int         newton[STAGE_STEPS], newtons;       /* of each step                            */
    double      push, ms, ms_contact, ms_worst;
    double      gap;                        /* m, least of cloth_collide_gap() after a step    */
    long double least;                      /* m, to spheres and planes                        */
} stage;

/* Steps of all stages that were accepted, leapfrog's left out. */
typedef struct stage_tally {
    int accepted, struck;                   /* struck: zones had rows to begin with            */
    int rowed, capped;                      /* ends with an active row; at the cap of Newton's */
} stage_tally;

static stage_tally stage_steps;

static inline double stage_clock(void *user) {
    (void)user;
    return (double)clock() / CLOCKS_PER_SEC;
}

static inline void stage_log(cloth_log_level level, cloth_status status, const char *text,
                             void *user) {
    (void)user;
    (void)status;
    if (level == CLOTH_LOG_ERROR) printf("    %s\n", text);
}

/* The mesh becomes the stage's. 1000 N/m, 1e-5 N m, 0.2 kg/m^2. */
static inline void stage_cloth(stage *s, cloth_mesh *mesh) {
    memset(s, 0, sizeof *s);
    s->mesh = mesh;
    s->desc = cloth_desc_default();
    s->contact = cloth_collide_desc_default();
    s->desc.hooks.clock.fn = stage_clock;
    s->desc.hooks.log.fn = stage_log;
    s->desc.nv = mesh->nv, s->desc.x_rest = mesh->x;
    s->desc.nf = mesh->nf, s->desc.faces = mesh->faces;
    s->desc.X = mesh->X;
    s->desc.material.membrane = 1000;
    s->desc.material.bending = 1e-5;
    s->desc.material.density = 0.2;
    s->desc.contact = CLOTH_CONTACT_SELF;
    s->nv = mesh->nv, s->nf = mesh->nf;
    s->least = 1;
    s->gap = 1;
    s->first_bad = -1;
    s->x = (double *)malloc(3 * (size_t)s->nv * sizeof(double));
    s->faces = (int *)malloc(3 * (size_t)s->nf * sizeof(int));
    if (!s->x || !s->faces) exit(2);
    memcpy(s->faces, mesh->faces, 3 * (size_t)s->nf * sizeof(int));
}

static inline void stage_sheet(stage *s, int n, double size) {
    cloth_mesh *mesh = NULL;
    if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, size, size, &mesh)) exit(2);
    stage_cloth(s, mesh);
}

/* Sheets of 0.4 m, n x n vertices each: 2 cm apart, each turned by 0.3 rad against the one below
 * and sloped by `slope` more. */
static inline void stage_layers(stage *s, int layers, int n, double slope) {
    cloth_mesh *layer[16] = {NULL}, *all = NULL;
    int         i, k;
    for (k = 0; k < layers; k++) {
        const double a = 0.3 * k;
        if (cloth_mesh_sheet(NULL, CLOTH_SHEET_ALTERNATING, n, n, 0.4, 0.4, layer + k)) exit(2);
        for (i = 0; i < layer[k]->nv; i++) {
            double      *x = layer[k]->x + 3 * i;
            const double p = x[0] - 0.2, q = x[2] - 0.2;
            x[0] = cos(a) * p - sin(a) * q;
            x[2] = sin(a) * p + cos(a) * q;
            x[1] = 0.02 + 0.02 * k + slope * k * p;
        }
    }
    if (cloth_mesh_merge(NULL, layer, layers, &all)) exit(2);
    for (k = 0; k < layers; k++) cloth_mesh_destroy(NULL, layer[k]);
    stage_cloth(s, all);
}

/* A sheet stands on its side, 1 cm above y = 0, with folds of two lengths. */
static inline void stage_upright(stage *s) {
    int i;
    for (i = 0; i < s->mesh->nv; i++) {
        double *x = s->mesh->x + 3 * i;
        x[1] = 0.01 + x[2];
        x[2] = 0.01 * sin(25 * x[1]) + 0.003 * sin(17 * x[0] + 5 * x[1]);
    }
}

/* Call when desc and contact are as wanted. */
static inline int stage_start(stage *s) {
    CHECK(cloth_model_create(&s->desc, &s->model) == CLOTH_OK);
    if (s->model) CHECK(cloth_sim_create(s->model, &s->sim) == CLOTH_OK);
    if (s->sim) CHECK(cloth_collide_create(s->sim, &s->contact, &s->c) == CLOTH_OK);
    if (!s->c) return 0;
    s->state = cloth_sim_state(s->sim);
    return 1;
}

/* Takes desc->x's numbers over; the meshes' faces join the list. Returns the thing's number. */
static inline int stage_add(stage *s, const cloth_obstacle_desc *d) {
    stage_thing *t = s->thing + s->nthing;
    int          i;
    t->kind = d->kind;
    t->nv = d->kind == CLOTH_OBSTACLE_MESH ? d->nv : d->kind == CLOTH_OBSTACLE_CAPSULE ? 2 : 1;
    t->nf = d->kind == CLOTH_OBSTACLE_MESH ? d->nf : 0;
    t->first = s->nv;
    t->radius = d->radius;
    memcpy(t->normal, d->normal, sizeof t->normal);
    t->x = (double *)malloc(3 * (size_t)t->nv * sizeof(double));
    t->next = (double *)malloc(3 * (size_t)t->nv * sizeof(double));
    if (!t->x || !t->next) exit(2);
    memcpy(t->x, d->x, 3 * (size_t)t->nv * sizeof(double));
    memcpy(t->next, d->x, 3 * (size_t)t->nv * sizeof(double));
    if (t->nf) {
        s->x = (double *)realloc(s->x, 3 * (size_t)(s->nv + t->nv) * sizeof(double));
        s->faces = (int *)realloc(s->faces, 3 * (size_t)(s->nf + t->nf) * sizeof(int));
        if (!s->x || !s->faces) exit(2);
        for (i = 0; i < 3 * t->nf; i++) s->faces[3 * s->nf + i] = s->nv + d->faces[i];
        s->nv += t->nv;
        s->nf += t->nf;
    }
    CHECK(cloth_collide_add(s->c, d, &t->id) == CLOTH_OK);
    return s->nthing++;
}

static inline int stage_plane(stage *s, double height, double friction) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    double              x[3] = {0, 0, 0};
    x[1] = height;
    d.kind = CLOTH_OBSTACLE_PLANE;
    d.x = x;
    d.friction = friction;
    return stage_add(s, &d);
}

static inline int stage_sphere(stage *s, double x, double y, double z, double radius) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    double              at[3];
    at[0] = x, at[1] = y, at[2] = z;
    d.kind = CLOTH_OBSTACLE_SPHERE;
    d.x = at;
    d.radius = radius;
    return stage_add(s, &d);
}

static inline int stage_mesh(stage *s, const shape *m, double friction) {
    cloth_obstacle_desc d = cloth_obstacle_desc_default();
    d.nv = m->nv, d.x = m->x;
    d.nf = m->nf, d.faces = m->faces;
    d.friction = friction;
    return stage_add(s, &d);
}

/* --- the examination --- */

static inline void stage_list(stage *s, const int *pair, int n) {
    if (n > s->pair_room) {
        s->pair = (int *)realloc(s->pair, 2 * (size_t)n * sizeof(int));
        if (!s->pair) exit(2);
        s->pair_room = n;
    }
    if (n) memcpy(s->pair, pair, 2 * (size_t)n * sizeof(int));
    s->npair = n;
}

/* Distance of p from the triangle abc, m (Ericson 2005, 5.1.5, in long double). */
static inline long double stage_distance(const double *p, const double *a, const double *b,
                                         const double *c) {
    const double *v[3];
    long double   n[3], e[3][3], r[3][3], len = 0, best = HUGE_VALL, above = 0;
    int           i, k, outside = 0;
    v[0] = a, v[1] = b, v[2] = c;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) {
            e[i][k] = (long double)v[(i + 1) % 3][k] - (long double)v[i][k];
            r[i][k] = (long double)p[k] - (long double)v[i][k];
        }
    for (k = 0; k < 3; k++)
        n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
    for (k = 0; k < 3; k++) len += n[k] * n[k], above += n[k] * r[0][k];
    for (i = 0; i < 3; i++) {
        long double side = 0, t = 0, ee = 0, d = 0;
        for (k = 0; k < 3; k++) {
            side += n[k] * (e[i][(k + 1) % 3] * r[i][(k + 2) % 3] -
                            e[i][(k + 2) % 3] * r[i][(k + 1) % 3]);
            t += e[i][k] * r[i][k];
            ee += e[i][k] * e[i][k];
        }
        if (side < 0) outside = 1;
        t = ee > 0 ? t / ee : 0;
        t = t < 0 ? 0 : t > 1 ? 1 : t;
        for (k = 0; k < 3; k++) d += (r[i][k] - t * e[i][k]) * (r[i][k] - t * e[i][k]);
        if (d < best) best = d;
    }
    return !outside && len > 0 ? fabsl(above) / sqrtl(len) : sqrtl(best);
}

/* Distance of the segment ab from the triangle v, m; 0 where they cross. */
static inline long double stage_bar_distance(const double *a, const double *b,
                                             const double *const v[3]) {
    static const int face[6] = {0, 1, 1, 2, 3, 4};
    double           x[15], q[24];
    long double      best, size = 0, d;
    int              i, k, pair[2];
    memcpy(x, a, 3 * sizeof *x), memcpy(x + 3, b, 3 * sizeof *x);
    for (i = 0; i < 3; i++) memcpy(x + 6 + 3 * i, v[i], 3 * sizeof *x);
    best = stage_distance(a, v[0], v[1], v[2]);
    d = stage_distance(b, v[0], v[1], v[2]);
    if (d < best) best = d;
    for (i = 0; i < 3; i++) {
        for (k = 0, d = 0; k < 3; k++) {
            const long double e = (long double)v[(i + 1) % 3][k] - (long double)v[i][k];
            d += e * e;
        }
        if (d > size) size = d;
        memcpy(q, x, 6 * sizeof *q);
        memcpy(q + 6, v[i], 3 * sizeof *q), memcpy(q + 9, v[(i + 1) % 3], 3 * sizeof *q);
        memcpy(q + 12, q, 12 * sizeof *q);
        d = ccd_distance(1, q, 0);
        if (d < best) best = d;
    }
    return best * best < size && exact_intersections(5, x, 2, face, pair, 1) ? 0 : best;
}

/* Smallest distance of the cloth from thing t, less its radius; meshes: none. */
static inline long double stage_clearance(const stage *s, const stage_thing *t) {
    const double *x = s->state->x;
    long double   least = HUGE_VALL, d;
    int           i, k;
    if (t->kind == CLOTH_OBSTACLE_PLANE)
        for (i = 0; i < s->mesh->nv; i++) {
            for (d = 0, k = 0; k < 3; k++)
                d += (long double)t->normal[k] * ((long double)x[3 * i + k] - (long double)t->x[k]);
            if (d < least) least = d;
        }
    if (t->kind == CLOTH_OBSTACLE_SPHERE)
        for (i = 0; i < s->mesh->nf; i++) {
            const int *f = s->mesh->faces + 3 * i;
            d = stage_distance(t->x, x + 3 * f[0], x + 3 * f[1], x + 3 * f[2]) -
                (long double)t->radius;
            if (d < least) least = d;
        }
    if (t->kind == CLOTH_OBSTACLE_CAPSULE)
        for (i = 0; i < s->mesh->nf; i++) {
            const double *v[3];
            for (k = 0; k < 3; k++) v[k] = x + 3 * s->mesh->faces[3 * i + k];
            d = stage_bar_distance(t->x, t->x + 3, v) - (long double)t->radius;
            if (d < least) least = d;
        }
    return least;
}

static inline int stage_has(const stage *s, int a, int b) {
    int low = 0, high = s->npair;
    while (low < high) {
        const int mid = low + (high - low) / 2, *p = s->pair + 2 * mid;
        if (p[0] < a || (p[0] == a && p[1] < b))
            low = mid + 1;
        else
            high = mid;
    }
    return low < s->npair && s->pair[2 * low] == a && s->pair[2 * low + 1] == b;
}

/* Pairs with cloth that intersect now and did not in the examination before: 0 is what is promised.
 * Things may pass through each other. */
static inline int stage_examine(stage *s) {
    static int found[2 * 4096];
    int        i, n, fresh = 0;
    memcpy(s->x, s->state->x, 3 * (size_t)s->mesh->nv * sizeof(double));
    for (i = 0; i < s->nthing; i++) {
        const stage_thing *t = s->thing + i;
        const long double  d = stage_clearance(s, t);
        if (t->nf) memcpy(s->x + 3 * t->first, t->x, 3 * (size_t)t->nv * sizeof(double));
        if (d < s->least) s->least = d;
        if (!(d >= 0)) s->inside++;
    }
    n = exact_intersections(s->nv, s->x, s->nf, s->faces, found, 4096);
    n = n < 4096 ? n : 4096;
    for (i = 0; i < n; i++)
        fresh += found[2 * i] < s->mesh->nf && !stage_has(s, found[2 * i], found[2 * i + 1]);
    stage_list(s, found, n);
    return fresh;
}

/* Pairs that intersect as of the last examination and of which one face or both are the cloth's. */
static inline int stage_crossings(const stage *s) {
    int i, n = 0;
    for (i = 0; i < s->npair; i++) n += s->pair[2 * i] < s->mesh->nf;
    return n;
}

/* The kit counts as many, right after an examination; more than 4096 are not compared. */
static inline int stage_parity(stage *s) {
    int n = -1;
    if (s->npair >= 4096) return 1;
    return cloth_collide_intersections(s->c, 0, NULL, &n) == CLOTH_OK && n == stage_crossings(s);
}

/* The step that r reports into the tally. */
static inline void stage_count(const stage *s, const cloth_report *r) {
    cloth_collide_contact *q = NULL;
    int                    i, n = 0, rows = 0;
    if (r->status || s->desc.integrator == CLOTH_INTEGRATOR_LEAPFROG) return;
    CHECK(cloth_collide_contacts(s->c, 0, NULL, &n) == CLOTH_OK);
    q = (cloth_collide_contact *)malloc((size_t)(n + 1) * sizeof *q);
    if (!q) exit(2);
    CHECK(cloth_collide_contacts(s->c, n, q, &n) == CLOTH_OK);
    for (i = 0; i < n; i++) rows += (q[i].flags & CLOTH_CONTACT_ROW) != 0;
    free(q);
    stage_steps.accepted++;
    stage_steps.struck += cloth_collide_last(s->c).rows > 0;
    stage_steps.rowed += rows > 0;
    stage_steps.capped += r->outcome == CLOTH_STEP_MAX_ITERATIONS;
}

/* One step, the things on their way to `next`; 1: accepted whole. */
static inline int stage_step(stage *s, double h) {
    cloth_report         r;
    cloth_collide_report k;
    cloth_status         status;
    int                  i, j, bad;
    for (i = 0; i < s->nthing; i++)
        (void)cloth_collide_move(s->c, s->thing[i].id, s->thing[i].next);
    status = cloth_collide_step(s->c, h, 6, &r);
    k = cloth_collide_last(s->c);
    stage_count(s, &r);
    s->steps++;
    s->whole += status == CLOTH_OK && k.fraction >= 1;
    s->shorter += status == CLOTH_OK && k.fraction < 1;
    s->failed += status != CLOTH_OK;
    for (i = 0; status == CLOTH_OK && i < s->nthing; i++)
        for (j = 0; j < 3 * s->thing[i].nv; j++) {
            double *x = s->thing[i].x + j, to = s->thing[i].next[j];
            *x = k.fraction < 1 ? *x + k.fraction * (to - *x) : to;
        }
    s->ms += r.ms.total;
    s->ms_contact += r.ms.contact;
    s->ms_worst = fmax(s->ms_worst, r.ms.total);
    if (s->newtons < STAGE_STEPS) s->newton[s->newtons++] = r.newton;
    s->passes = k.passes > s->passes ? k.passes : s->passes;
    s->zones = k.zones > s->zones ? k.zones : s->zones;
    s->rows = k.rows > s->rows ? k.rows : s->rows;
    s->zone = k.largest_zone > s->zone ? k.largest_zone : s->zone;
    s->rigid += k.rigid_zones;
    s->push = fmax(s->push, k.push);
    if (status == CLOTH_OK) {
        double gap = 1;
        if (!cloth_collide_gap(s->c, 0.5 * s->contact.thickness, &gap)) s->gap = fmin(s->gap, gap);
        bad = stage_examine(s);
        s->new_pairs += bad;
        s->miscounted += !stage_parity(s);
        if (bad && s->first_bad < 0) s->first_bad = s->steps;
    }
    if (getenv("SHOW_STEPS"))
        printf("   %4d st %d fr %g newton %d halv %d proj %d res %.1e imp %d pass %d zones %d rows "
               "%d big %d rigid %d contacts %d push %.1e qp %d bad %d ms %.1f begin %.1f det %.1f "
               "zone %.1f\n",
               s->steps, (int)status, k.fraction, r.newton, r.halvings, r.projected, r.residual_m,
               k.impacts, k.passes, k.zones, k.rows, k.largest_zone, k.rigid_zones, k.contacts,
               k.push, k.qp_iterations, s->npair, r.ms.total, k.ms_begin, k.ms_detect, k.ms_zones);
    return status == CLOTH_OK && k.fraction >= 1;
}

static inline void stage_title(void) {
    printf("  whole: accepted at full length; gap/t: smallest distance after any step; clear: from "
           "spheres and\n  planes; share: contact's in the time of the step\n");
    printf("  %-17s %5s %6s %5s %4s %5s %6s %8s %10s %6s %5s %6s %6s %5s %7s %7s %7s %5s\n",
           "scene", "steps", "whole%", "short", "fail", "pairs", "gap/t", "clear m", "newton",
           "passes", "zones", "rows", "zone", "rigid", "push m", "ms/step", "worst", "share");
}

/* The middle and the largest of n counts, which become sorted. */
static inline int stage_median(int *count, int n, int *most) {
    int i, j;
    for (i = 1; i < n; i++)
        for (j = i; j > 0 && count[j] < count[j - 1]; j--) {
            const int swap = count[j];
            count[j] = count[j - 1];
            count[j - 1] = swap;
        }
    *most = n ? count[n - 1] : 0;
    return n ? count[n / 2] : 0;
}

static inline void stage_print(stage *s, const char *name) {
    const double n = s->steps > 0 ? s->steps : 1;
    char         newton[32];
    int          most, median = stage_median(s->newton, s->newtons, &most);
    (void)sprintf(newton, "%d/%d", median, most);
    printf("  %-17s %5d %6.2f %5d %4d %5d %6.3f %8.1Le %10s %6d %5d %6d %6d %5d %7.1e %7.1f %7.0f "
           "%5.2f\n", name, s->steps, 100 * s->whole / n, s->shorter, s->failed, s->new_pairs,
           s->gap / s->contact.thickness, s->least, newton, s->passes, s->zones, s->rows, s->zone,
           s->rigid, s->push, s->ms / n, s->ms_worst, s->ms > 0 ? s->ms_contact / s->ms : 0);
    fflush(stdout);
}

/* K + P, J: K from masses and speeds, P (strain, bending, height) by a second model of the same
 * cloth that knows of no contact. */
static inline double stage_energy(stage *s) {
    const double *mass = cloth_sim_params(s->sim)->mass, *v = s->state->v;
    cloth_desc    plain = s->desc;
    double        sum = NAN;
    int           i;
    plain.contact = CLOTH_CONTACT_NONE;
    if (!s->plain) CHECK(cloth_model_create(&plain, &s->plain) == CLOTH_OK);
    if (!s->still) CHECK(cloth_sim_create(s->plain, &s->still) == CLOTH_OK);
    CHECK(cloth_sim_potential(s->still, s->state->x, &sum, NULL) == CLOTH_OK);
    for (i = 0; i < 3 * s->mesh->nv; i++) sum += 0.5 * mass[i / 3] * v[i] * v[i];
    return sum;
}

/* Rows of impact zones hold where minimising begins: of the stages before this test, the steps
 * after which one still pushes. Leapfrog, which ends each substep with them, is left out. */
static inline void stage_rows_left(void) {
    const stage_tally *t = &stage_steps;
    if (!t->accepted) SKIP("needs the scenes before it");
    printf("    of %d accepted implicit steps %d began with impacts, %d end with active rows, %d at"
           " the cap of Newton's iterations\n", t->accepted, t->struck, t->rowed, t->capped);
    CHECK(t->struck > 0);
    CHECK(t->rowed < 0.02 * t->accepted);
}

/* What is asked of every scene. */
static inline void stage_judge(stage *s, const char *name) {
    stage_print(s, name);
    CHECK(s->new_pairs == 0);
    CHECK(s->miscounted == 0);
    CHECK(s->inside == 0);
    CHECK(s->failed == 0);
    CHECK(s->whole >= 0.99 * s->steps);
}

static inline void stage_end(stage *s) {
    int i;
    cloth_collide_destroy(s->c);
    cloth_sim_destroy(s->sim);
    cloth_model_destroy(s->model);
    cloth_sim_destroy(s->still);
    cloth_model_destroy(s->plain);
    cloth_mesh_destroy(NULL, s->mesh);
    for (i = 0; i < s->nthing; i++) {
        free(s->thing[i].x);
        free(s->thing[i].next);
    }
    free(s->x);
    free(s->faces);
    free(s->pair);
    memset(s, 0, sizeof *s);
}

#endif
