/* kdsm/07_locate.c - what it costs to find the tetrahedra that hold a point, and without a tree.
 *
 * Notice: kdsm_locate() in a pose whose space is folded and turned inside out in places, for spaces
 * from coarse to fine; beside it every tetrahedron asked in turn. Both must name the same
 * candidates in the same order.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/07_locate.c -lm
 *   page:     out/07_locate.svg
 *   expected: the same candidates: yes
 *
 * Of 1e5 points, by code of its own: tests/test_kdsm.c, locate_is_brute_force, full tier.
 */
#define KDSM_IMPLEMENTATION
#include "figure.h"
#include "plot.h"
#include <time.h>
#define POINTS 20000
#define ASKED  60           /* of them without a tree                                   */
#define MOST   512

static double since(clock_t start) { return (double)(clock() - start) / CLOCKS_PER_SEC; }

/* A point in or beside a tetrahedron of the pose, drawn by its number. */
static void point(const kdsm_pose *pose, int i, double *p) {
    const kdsm_space *s = pose->space;
    const int         t = (int)(0.5 * (figure_random(1, i) + 1) * s->nt);
    double            w[4], sum = 0;
    int               k;
    for (k = 0; k < 4; k++) sum += w[k] = 1.1 + figure_random(2 + (uint64_t)k, i);
    p[0] = p[1] = p[2] = 0;
    for (k = 0; k < 12; k++)
        p[k % 3] += w[k / 3] / sum * pose->x[3 * s->tet[4 * t + k / 3] + k % 3];
}

/* [5.2] over all tetrahedra; returns how many candidates are left. */
static int by_all(const kdsm_pose *pose, const double *p, kdsm_candidate *list) {
    const kdsm_space *s = pose->space;
    int               t, i, j, n = 0, left;
    for (t = 0; t < s->nt; t++) {
        kdsm_candidate c;
        if (!kdsmi_inside(s, pose->x, t, p, &c) || c.depth < -KDSM_DEFAULT_EPSILON) continue;
        if (n == MOST) return -1;
        for (i = n++; i > 0 && kdsmi_deeper(&c, list + i - 1); i--) list[i] = list[i - 1];
        list[i] = c;
    }
    for (i = 0; i < n; i++) {
        for (left = j = i + 1; j < n; j++)
            if (!kdsmi_beside(s, list + i, list + j)) list[left++] = list[j];
        n = left;
    }
    return n;
}

/* Microseconds a point by tree and by all: us [2]; *wrong: points on which they disagree. */
static const char *measure(kdsm_pose *pose, double *us, int *wrong, int *several) {
    static kdsm_candidate got[MOST], want[MOST];
    static double         p[POINTS][3];
    clock_t               start;
    int                   i, k, count;
    for (i = 0; i < POINTS; i++) point(pose, i, p[i]);
    start = clock();
    for (*several = i = 0; i < POINTS; i++) {
        if (kdsm_locate(pose, p[i], MOST, got, &count, NULL)) return "a point is not located";
        *several += count > 1;
    }
    us[0] = 1e6 * since(start) / POINTS, us[1] = 0;
    for (i = 0; i < ASKED; i++) {
        start = clock();
        k = by_all(pose, p[i], want);
        us[1] += 1e6 * since(start) / ASKED;
        if (kdsm_locate(pose, p[i], MOST, got, &count, NULL)) return "a point is not located";
        *wrong += k != count;
        for (k = 0; k < count; k++) *wrong += got[k].tet != want[k].tet;
    }
    return NULL;
}

static const char *one(const figure *f, double coarse, plot *p, const int *series, int *wrong) {
    kdsm_desc    d = kdsm_desc_default();
    kdsm_space  *space = NULL;
    kdsm_pose   *pose = NULL;
    kdsm_quality q;
    const char  *error = NULL;
    double       T[12 * SHAPES_BONES], us[2];
    int          several = 0, k;
    figure_body(f, &d);
    d.hooks.log.fn = cloth_log_stderr, d.coarse = coarse;
    figure_pose(f, 1, 1.6, T);
    if (kdsm_create(&d, &space) || kdsm_pose_create(space, &pose) || kdsm_pose_set(pose, T))
        error = "there is no space in a pose";
    if (!error) error = measure(pose, us, wrong, &several);
    if (!error) {
        q = kdsm_measure(space, pose->x);
        printf("%7d tetrahedra, %5d inverted; %5d of %d points in several; %6.2f us a point, asking"
               " all %8.1f\n", space->nt, q.inverted, several, POINTS, us[0], us[1]);
        for (k = 0; k < 2; k++) plot_point(p, series[k], space->nt, us[k], NULL);
    }
    kdsm_pose_destroy(pose), kdsm_destroy(space);
    return error;
}

int main(void) {
    static const double coarse[5] = {0.2, 0.14, 0.1, 0.07, 0.05};
    figure              f;
    plot               *p = plot_open("Which tetrahedra hold a point?", "tetrahedra",
                                      "CPU time a point (us)");
    const char         *error = figure_make(0.03, &f), *wrong;
    int                 series[2], k, differ = 0;
    plot_axes(p, 1, 1);
    series[0] = plot_series(p, "kdsm_locate()"), series[1] = plot_series(p, "asking all");
    for (k = 0; k < 5 && !error; k++) error = one(&f, coarse[k], p, series, &differ);
    wrong = plot_close(p, "out/07_locate.svg");
    if (!error) error = wrong;
    if (error) fprintf(stderr, "%s\n", error);
    else printf("the same candidates: %s\n", differ == 0 ? "yes" : "no");
    figure_free(&f);
    return error != NULL;
}
