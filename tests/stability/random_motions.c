/* random_motions.c - bodies whose joints are driven at random, or into poses that others drew, do
 * not swallow their garments.
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I. stability/random_motions.c -lm
 * tier: default
 *
 * Seeded turns of arms, elbows, thighs, knees and trunk (skeleton.h) drive the body of the examples
 * through its armpits, elbows and thighs, in its shirt and in a skirt whose waist is pinned; and
 * the bodies of ../shared in garments of theirs, where they are there, the female one also from
 * rest to poses of ../shared and back in half a second each. 1/60 s, default settings; a step that
 * fails is tried as two halves, to an eighth, else the body waits.
 *
 *   swallowed  share of the cloth's vertices in the body, where it does not overlap itself, deeper
 *              than 3 mm, by the winding number; in every 6th frame: worst 1 %, mean 0.2 %
 *   stretch    no edge beyond 2.5 times its length
 *   steps      none failed, 95 % whole
 *
 * FULL=1: 20 seeds of 120 steps each, 4 for each garment of ../shared; else 1 seed, 24 steps.
 * SEEDS=N, FIRST=SEED and STEPS=N in the environment change that.
 *
 * The pull on cloth in pinches ([8.3] of clothsim_collide.h) was chosen by this program and by the
 * walk of ../shared in its skirt, of which figures of one run move by a third with the last bits:
 * seven runs that begin a nanometre apart (fewer where said), % in the body in the mean, in the
 * worst frame on average (most), longest edge. F on what is held, what goes out:
 *   K t/2, 9 K t      0.19, 0.87 (1.45), 2.2   trousers that jump 1.3 and 1.6 in the worst frame
 *   K t/2, 13 K t     0.18, 0.79 (1.19), 2.6
 *   K t/2, 18 K t     0.16, 0.75 (0.92), 2.6   0.4 and 0.7
 *   K t/2, 27 K t     0.11, 0.62 (0.92), 2.9   1.0 of one, edges 2.8
 *   that, less by stretched edges: 0.14, 0.66 (0.92), 2.3   0.7 and 1.0, edges 2.6; chosen
 *     since zones are solved by the QP alone: 0.17, 0.74 (1.32), 2.6 of ten
 *   both less by them 0.16, 0.73 (1.05), 2.3   0.7 and 1.0
 *   that, without what goes aside: 0.24, 0.85 (1.05) of two
 *   K t, 9 K t        0.22, 0.8 (1.2) of six; edges of trousers to 2.8
 *   K t, 27 K t       0.17 of two
 *   K t/4, 9 K t      0.18, 0.7 (0.8); but the armpits of three motions of eight of the shirt hold
 *                     0.7 to 1.2 %, where K t/2 has 0.4 in two; 0.1 K t: 0.23 of one
 *   K t/4, 18 K t     0.21, 1.2 (1.84) of five; the shirt 0.3 at most
 *   3 K t, 9 K t      likewise, and failed steps; 9 K t for all: edges of a T-shirt of 2.4, and its
 *                     steps fail from the 50th on
 * With K t on what is held, in the mean: from x^n and by tension 0.28; three springs of 0.3, 3 and
 * 30 K, 9 K t for all, 0.24 to 0.36; F by the root of a vertex's area 0.25, and failed steps; out
 * along the line of intersection 0.28, all that crosses 1.2; F by the strain e of its edges, K t (1
 * + 8 max(0, 1 - e)) for both, 0.16 to 0.27, but trousers 0.10 for 0.06, to e = 0.5 0.21 to 0.28,
 * and edges of 3.0. On what is outside when the substep ends K t or no pull: 0.30, 0.34.
 * Where to, with that: out from x^n to what is nearest to it there, cloth in a hand was carried
 * with it, was left behind, and stayed in, as it did by the side that taut cloth pulls to, or that
 * it came in by; aside, to what is nearest of all that there is, 0.30. Minimising that begins above
 * the surface, not where it was: trousers halved 10 steps of 120 for 4.
 * The share of what is held came back by t a substep, far behind a limb that goes 50 mm in one:
 * four starts of a polo shirt that jumps had 0.4 to 1.7 % in the worst frame. By 10 t: 0.4 to 0.6;
 * skirt that walks 0.11 in the mean for 0.13 of three, that jumps 0.9, 1.3 for 1.6, 1.3; trousers
 * that jump 0.3 to 1.0 for 0.1 to 0.4. Then 3 K t on what goes aside: 0.4 to 1.1, 0.19, edges of
 * 2.7; that alone, trousers 0.9 to 1.6. A search that goes on past 60 while phi falls: the same.
 * Aside also to where both parts are, if that is nearer: trousers that jump 0.1 to 0.4 for 0.3 to
 * 1.0, skirt that walks 0.15, 0.19, 0.14 in the mean for 0.12, 0.08, 0.14, edges of 2.9.
 * What is led out of a crossing, from outside, went with what it was nearest to: up test_pinch's
 * rod (`poked`, `drawn`), and a hand that left a hip drew trousers 0.2 m along by 30 to 80 N, where
 * friction has 5, their edges to 2.2 .. 2.6. Pushed along the normal there alone, till t farther
 * out: the longest edge 2.27 for 2.32 .. 2.56; of the skirt that walks, three starts, the mean of
 * all frames 0.08, 0.04, 0.09 for 0.08, 0.17, 0.09. To where it goes by itself and t out it took
 * up speed, by 27 K t, and by 3 K t some stayed held; not led where the normals of what is there
 * through cloth have no mean along the nearest one's: skirt 0.16, polo 0.13 for 0.12, 0.06; by
 * their mean 0.20, 0.08.
 * Substeps where points of a hold pass each other by more than so much in a step: mean of frames
 * 30 to 80 (worst one), by starts; 5 t is chosen.
 *                        none               10 t         5 t                2.5 t        two always
 *   polo shirt's jump    0.12, 0.10 (1.06)  0.06 (0.53)  0.04, 0.05 (0.32)  0.02 (0.14)  0.05, 0.02
 *   trousers' jump       0.14 (0.92)        0.08 (0.52)  0.10, 0.06 (0.43)  0.03 (0.14)  0.03
 *   trousers' walk       0.07, 0.06 (0.34)  0.06 (0.23)  0.02 (0.17)                     0.05
 *   skirt's jump         0.07 (0.86)                     0.03, 0.03 (0.40)               0.04
 *   skirt's walk         0.21, 0.18 (0.86)  0.16 (0.66)  0.10, 0.11, 0.15   0.15 (0.66)  0.15
 * at 0.9 to 1.1 of the time; T-shirt's walk of 80 steps, 0.01 by all, 1.4 of it by the last two.
 * With them a share that comes back by 10 t at most changes no bit of polo and trousers, and went;
 * all that is inside held, none of it out: skirt's walk 0.42; points that do not slide: T-shirt's
 * walk 0.16; pulls out that stretched edges do not lessen: the same, skirt's edges 2.46 for 2.05.
 * Without what goes aside: the same to frame 80, but polo's 200 frames, three starts, 0.16, 0.05,
 * 0.02 for 0.02, 0.02, 0.03.
 * To the nearest place above which no part is, where there is one above the nearest: what goes out,
 * skirt three starts (0.17), polo one (0.11): however far 0.22, 0.16, trousers 0.12 for 0.06 and
 * twice the time; 20 mm at most 0.15, 0.18; that with the pull of what is held 0.17, 0.19; with
 * substeps, 40 mm at most, skirt 0.08, 0.11, polo 0.11, 0.16 and edges of 3.0, twice the time.
 * Out to the nearest of faces that it is inside of: jumps of a coarse skirt, trousers (four, three
 * starts) and clean ones (one) 0.09, 0.66, 0.07 for 0.14, 0.78, 0.19, but of the polo (two) 0.05
 * for 0.03, walks of coarse trousers (four) and a skirt (two) 0.24, 0.10 for 0.21, 0.08.
 * 3 K t on what goes aside, with substeps: jumps of a coarse skirt, trousers (four, three starts)
 * 0.08, 0.48 for 0.14, 0.78, of clean ones (two) 0.08 for 0.13, walks of a skirt (four) 0.11 as
 * with K t/2, of polo 0.02 for 0.03; but the trousers' walk has edges of 2.57, 2.87, 2.60 for 2.28,
 * 2.34, 2.57, and with pulls that these lessen 2.72 (9 K t 2.36). K t: 2.56, 2.32, 2.46, jumps of
 * clean trousers (one) 0.02 for 0.19, but of the coarse ones 0.81 for 0.94, 0.12 for 0.12 (two).
 * Out as the cloth that hangs on it and is nearer to the outside does, ring by ring: the same bits
 * of skirt and polo.
 * Out to the nearest, or, deeper than so many t, by that of its own points which it is behind, slid
 * to what is nearest: mean of frames, by starts (worst one).
 *                                  nearest        8 t        5 t        3 t        0, always
 *   blouse cut from a man, jump    0.40           0.06       0.06       0.09, 0.08 0.08
 *   trousers, sitting down fast    0.43, 0.81     0.37, 0.63 0, 0, 0.70 0, 0, 0
 *   coarse trousers' jump          0.73           0.54, 0.35 0.26, 0.23 0.22, 0.22 0.30
 *   polo shirt's jump              0.03           0.03       0.02       0.03
 *   skirt's walk, four starts      0.05 (0.66)    the same   0.08 (0.72) 0.07 (0.72) 0.12 of three
 *   trousers' walk                 0.04           the same   0.04       0.04       0.06
 * The fast one is sit01 of ../shared, there in 0.28 to 0.31 s: its knees bend by more than a right
 * angle, and cloth was pulled to all sides of the leg for good. Where another part is above its own
 * point, it is held between both: out to the nearest then, 0.86 for 0.37 of the fast one at 8 t.
 * With 3 t, and without what goes aside: skirt's walk 0.10, coarse trousers 0.30. As hard as what
 * goes out (chosen), not as what is held: shorts cut from a man that jump, three starts, 0.14 for
 * 0.20, the blouse 0.05 for 0.09, coarse trousers 0.21 for 0.22, skirt's walk 0.10 for 0.08.
 * Caught by the normals of faces alone, edges that meet were missed, and a T-shirt's walk failed;
 * by the nearest of all faces, a fold that is inside out hid one part, and a skirt failed as its
 * body sat down. All out to what is nearest: sleeves that an arm had passed and trousers of a body
 * that sat down fast stayed in it for good, as did a crumpled sheet in a vise, near the back of its
 * jaw. Edges across from a held vertex that are not led: trousers' steps failed from there on for
 * good. In whole steps where an arm passes the torso by 27 mm, cloth between them came out into one
 * of both, three times as much of it at no less cost. Nailed to where they are pulled, edges of a
 * T-shirt's armpit grew to 4 to 18 times their length, and held layers crossed; without a bound of
 * the pull those of trousers to 3.8. A held vertex exempt against all of the body, an edge beside
 * one face of the pinch: a long skirt that a wrist swept over went in by 20 pairs where no pinch
 * was. */
#include "../../clothsim_collide.h"

#include "../test.h"
#include "../edges.h"
#include "../../examples/shapes.h"
#include "skeleton.h"

typedef struct dressed {
    const skeleton       *k;
    const skeleton_motion *m;
    cloth_desc     desc;
    cloth_model   *model;
    cloth_sim     *sim;
    cloth_collide *c;
    cloth_obstacle id;
    double        *now, *next;              /* [k->nv x 3] the body                            */

    /* what came of it */
    int    steps, whole, failed, halved, frames, worst_frame;
    double worst, sum, deep, stretch;       /* %, %, m                                         */
} dressed;

static int dress(dressed *d, double t, double h, int depth) {
    skeleton_pose(d->k, d->m, t + h, d->next);
    if (cloth_collide_move(d->c, d->id, d->next) != CLOTH_OK) return 0;
    if (cloth_step(d->sim, h, NULL) == CLOTH_OK) {
        memcpy(d->now, d->next, 3 * (size_t)d->k->nv * sizeof(double));
        return 1;
    }
    if (depth == 3) return 0;
    d->halved++;
    return dress(d, t, h / 2, depth + 1) && dress(d, t + h / 2, h / 2, depth + 1);
}

static void look(dressed *d, int frame) {
    const int    stride = d->desc.nv / 600 > 1 ? d->desc.nv / 600 : 1;
    const double share = skeleton_swallowed(d->k, d->now, cloth_sim_state(d->sim)->x, d->desc.nv,
                                            stride, &d->deep);
    if (share > d->worst) d->worst = share, d->worst_frame = frame;
    d->sum += share;
    d->frames++;
}

/* desc: nv, nf, faces, x_rest, X, pins. */
static dressed dance(const skeleton *k, const cloth_desc *desc, const skeleton_motion *m,
                     int steps) {
    cloth_collide_desc    contact = cloth_collide_desc_default();
    cloth_obstacle_desc   o = cloth_obstacle_desc_default();
    dressed               d;
    int                   i;
    memset(&d, 0, sizeof d);
    d.k = k, d.m = m, d.desc = *desc;
    d.desc.material = cloth_material_fabric(CLOTH_FABRIC_COTTON_KNIT);
    d.desc.contact = CLOTH_CONTACT_SELF;
    contact.initial = CLOTH_INITIAL_EXEMPT;
    d.now = (double *)malloc(3 * (size_t)k->nv * sizeof(double));
    d.next = (double *)malloc(3 * (size_t)k->nv * sizeof(double));
    if (!d.now || !d.next) exit(2);
    skeleton_pose(k, m, 0, d.now);
    o.nv = k->nv, o.nf = k->nf, o.faces = k->faces, o.x = d.now;
    o.self_penetrating = 1;
    CHECK(cloth_model_create(&d.desc, &d.model) == CLOTH_OK);
    if (d.model) CHECK(cloth_sim_create(d.model, &d.sim) == CLOTH_OK);
    if (d.sim) CHECK(cloth_collide_create(d.sim, &contact, &d.c) == CLOTH_OK);
    if (d.c && CHECK(cloth_collide_add(d.c, &o, &d.id) == CLOTH_OK))
        for (i = 1; i <= steps; i++) {
            const int halved = d.halved, done = dress(&d, (i - 1) / 60.0, 1 / 60.0, 0);
            d.steps++;
            d.failed += !done;
            d.whole += done && d.halved == halved;
            d.stretch = fmax(d.stretch, edges_longest(&d.desc, cloth_sim_state(d.sim)->x));
            if (i % 6 == 0) look(&d, i);
        }
    cloth_collide_destroy(d.c);
    cloth_sim_destroy(d.sim);
    cloth_model_destroy(d.model);
    free(d.now);
    free(d.next);
    return d;
}

static int asked(const char *name, int otherwise) {
    return getenv(name) ? atoi(getenv(name)) : otherwise;
}

typedef struct tally {                      /* of all motions                                  */
    double frame, mean, stretch, whole;
    int    failed;
} tally;

static void header(void) {
    printf("    garment        motion    worst %% frame  mean %%  deep mm stretch whole halved "
           "failed\n");
}

static void count(tally *w, const char *garment, const char *motion, dressed d) {
    const double mean = d.sum / (d.frames ? d.frames : 1);
    printf("    %-14s %-9s %7.2f %5d %7.3f %8.1f %7.2f %5d %6d %6d\n", garment, motion, d.worst,
           d.worst_frame, mean, 1e3 * d.deep, d.stretch, d.whole, d.halved, d.failed);
    fflush(stdout);
    w->frame = fmax(w->frame, d.worst);
    w->mean = fmax(w->mean, mean);
    w->stretch = fmax(w->stretch, d.stretch);
    w->whole = fmin(w->whole, (double)d.whole / (d.steps ? d.steps : 1));
    w->failed += d.failed;
}

static void judge(const tally *w) {
    OPEN_MOST(w->frame, 1, "swallowed in the worst frame, %");
    OPEN_MOST(w->mean, 0.2, "swallowed in the mean, %");
    OPEN_MOST(w->stretch, 2.5, "longest edge over its length");
    OPEN_MOST(w->failed, 0, "failed steps");
    OPEN(w->whole >= 0.95, "steps at full length %.0f %% (at least 95)", 100 * w->whole);
}

/* All seeds of one garment, a line each; the worst of them is what counts. Where something is
 * pinned the arms stay: they would reach what cannot give way. */
static void dances(const skeleton *k, const cloth_desc *desc, const char *name, int seeds,
                   int steps) {
    tally w = {0, 0, 0, 1, 0};
    int   s, i, j;
    seeds = asked("SEEDS", seeds), steps = asked("STEPS", steps);
    header();
    for (s = 0; s < seeds; s++) {
        const unsigned  seed = (unsigned)(asked("FIRST", 1) + s);
        skeleton_motion m = skeleton_random(k, seed);
        char            text[16];
        for (i = 0; desc->npins && i < SKELETON_KEYS; i++)
            for (j = 0; j <= SKELETON_RIGHT_FOREARM; j++)
                memset(m.turn[i][k->driven[j]], 0, sizeof m.turn[i][j]);
        (void)sprintf(text, "%u", seed % 1000000u);
        count(&w, name, text, dance(k, desc, &m, steps));
    }
    judge(&w);
}

/* --- the body of the examples --- */

static void shirt(void) {
    const char  *error;
    shapes_shirt s;
    skeleton     k;
    cloth_desc   desc = cloth_desc_default();
    CHECK(skeleton_formula(&k, test_full() ? 0.029 : 0.03));
    error = shapes_shirt_make(test_full() ? 0.024 : 0.035, &s);
    CHECK(error == NULL);
    if (!error) {
        desc.nv = s.nv, desc.nf = s.nf, desc.faces = s.faces;
        desc.X = s.X, desc.x_rest = s.x, desc.rest_angle = CLOTH_REST_ANGLE_FLAT;
        dances(&k, &desc, "formula shirt", test_full() ? 20 : 1, test_full() ? 120 : 24);
        shapes_shirt_free(&s);
    }
    skeleton_free(&k);
}

/* A tube around the hips, y = 0.61 to 1.03 m, its upper ring pinned to the pelvis, which stays. */
static void skirt(void) {
    const int   around = test_full() ? 64 : 36, along = test_full() ? 20 : 12;
    cloth_mesh *mesh = NULL;
    skeleton    k;
    cloth_desc  desc = cloth_desc_default();
    cloth_pin  *pin = (cloth_pin *)calloc((size_t)around, sizeof *pin);
    int         i;
    if (!pin) exit(2);
    CHECK(skeleton_formula(&k, test_full() ? 0.029 : 0.03));
    if (!CHECK(cloth_mesh_tube(NULL, 0.21, 0.42, around, along, &mesh) == CLOTH_OK)) exit(2);
    for (i = 0; i < mesh->nv; i++) mesh->x[3 * i + 1] += 0.61;
    for (i = 0; i < around; i++) {
        pin[i].vertex = (along - 1) * around + i;
        pin[i].axes = CLOTH_AXIS_ALL;
    }
    desc.nv = mesh->nv, desc.nf = mesh->nf, desc.faces = mesh->faces, desc.x_rest = mesh->x;
    desc.npins = around, desc.pins = pin;
    dances(&k, &desc, "skirt", test_full() ? 20 : 1, test_full() ? 120 : 24);
    cloth_mesh_destroy(NULL, mesh);
    free(pin);
    skeleton_free(&k);
}

/* --- the bodies of ../shared --- */

static int wardrobe(const char *file, cloth_mesh **mesh, cloth_desc *desc) {
    *desc = cloth_desc_default();
    if (cloth_obj_load(NULL, test_shared(file), NULL, mesh) != CLOTH_OK) return 0;
    desc->nv = (*mesh)->nv, desc->nf = (*mesh)->nf;
    desc->faces = (*mesh)->faces, desc->x_rest = (*mesh)->x;
    return 1;
}

static void shared(const char *body, const char *file, const char *name) {
    cloth_mesh *mesh = NULL;
    cloth_desc  desc;
    skeleton    k;
    if (!skeleton_shared(&k, body, "cmu")) SKIP("no such body in ../shared");
    if (!wardrobe(file, &mesh, &desc)) {
        skeleton_free(&k);
        SKIP("no such garment in ../shared");
    }
    dances(&k, &desc, name, 4, 120);
    cloth_mesh_destroy(NULL, mesh);
    skeleton_free(&k);
}

/* Of the faces of a body those that are of these joints alone, `off` m above it along its normals,
 * which are smoothed thrice: cloth closer to it, and further into its folds, than any garment of
 * ../shared. x [3 nv] and faces [3 nf] are the caller's to free. */
static void cut(const skeleton *k, const char *joints, double off, double **x, int **faces,
                cloth_desc *desc) {
    const size_t n = (size_t)k->nv;
    double      *most = (double *)calloc(7 * n, sizeof *most), *now = most + n, *next = now + 3 * n;
    int         *to = (int *)calloc(n, sizeof *to), i, j, a, turn;
    *x = (double *)malloc(3 * n * sizeof **x);
    *faces = (int *)malloc(3 * (size_t)k->nf * sizeof **faces);
    if (!most || !to || !*x || !*faces) exit(2);
    for (i = 0; i < k->nw; i++) {           /* -1: its joint is one of these */
        char word[40];
        if (!(k->weight[i] > most[k->vertex[i]])) continue;
        most[k->vertex[i]] = k->weight[i];
        (void)sprintf(word, " %.32s ", k->name[k->joint[i]]);
        to[k->vertex[i]] = strstr(joints, word) ? -1 : -2;
    }
    for (i = 0; i < k->nf; i++) {
        const int *f = k->faces + 3 * i;
        double     u[3], v[3];
        for (a = 0; a < 3; a++) {
            u[a] = k->x[3 * f[1] + a] - k->x[3 * f[0] + a];
            v[a] = k->x[3 * f[2] + a] - k->x[3 * f[0] + a];
        }
        for (j = 0; j < 9; j++)
            now[3 * f[j / 3] + j % 3] += u[(j + 1) % 3] * v[(j + 2) % 3] -
                                         u[(j + 2) % 3] * v[(j + 1) % 3];
    }
    for (turn = 0; turn < 4; turn++) {
        for (i = 0; i < k->nv; i++) {
            double *p = now + 3 * i, size = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
            for (a = 0; a < 3 && size > 0; a++) p[a] /= size;
        }
        memset(next, 0, 3 * n * sizeof *next);
        for (i = 0; i < 27 * k->nf; i++) {
            const int *f = k->faces + 3 * (i / 27);
            next[3 * f[i % 9 / 3] + i % 3] += now[3 * f[i % 27 / 9] + i % 3];
        }
        if (turn < 3) memcpy(now, next, 3 * n * sizeof *next);
    }
    for (desc->nv = desc->nf = i = 0; i < k->nf; i++) {
        const int *f = k->faces + 3 * i;
        if (to[f[0]] < -1 || to[f[1]] < -1 || to[f[2]] < -1) continue;
        for (j = 0; j < 3; j++) {
            if (to[f[j]] < 0) {
                for (a = 0; a < 3; a++)
                    (*x)[3 * desc->nv + a] = k->x[3 * f[j] + a] + off * now[3 * f[j] + a];
                to[f[j]] = desc->nv++;
            }
            (*faces)[3 * desc->nf + j] = to[f[j]];
        }
        desc->nf++;
    }
    desc->x_rest = *x, desc->faces = *faces;
    free(most);
    free(to);
}

/* A blouse with long sleeves and shorts, 6 mm off a man who jumps. */
static void shared_cut(void) {
    static const char *const joints[] = {
        " Hips LHipJoint RHipJoint LowerBack Spine Spine1 LeftShoulder RightShoulder LeftArm "
        "RightArm LeftForeArm RightForeArm ",
        " Hips LHipJoint RHipJoint LowerBack LeftUpLeg RightUpLeg "};
    tally           w = {0, 0, 0, 1, 0};
    skeleton_motion m;
    skeleton        k;
    int             g;
    if (!skeleton_shared(&k, "body_m", "cmu")) SKIP("no such body in ../shared");
    header();
    CHECK(skeleton_skin(&k, test_shared("data/motion/jump_02_04.skin"), &m));
    for (g = 0; g < 2 && m.captured; g++) {
        cloth_desc desc = cloth_desc_default();
        double    *x;
        int       *faces;
        cut(&k, joints[g], 0.006, &x, &faces, &desc);
        count(&w, g ? "shorts" : "blouse", "jump", dance(&k, &desc, &m, asked("STEPS", 80)));
        free(x);
        free(faces);
    }
    judge(&w);
    free(m.captured);
    skeleton_free(&k);
}

/* From rest to the pose, there for half a second, and back; one of them also in 0.3 s. */
static void shared_poses(void) {
    static const char *const pose[] = {"sit01", "sit01", "run01", "fight01", "benchmark"};
    static const char *const garment[] = {"longskirt_f", "trousers_f"};
    const int                n = asked("SEEDS", 5);
    tally                    w = {0, 0, 0, 1, 0};
    skeleton                 k;
    int                      g, i;
    if (!skeleton_shared(&k, "body", "default")) SKIP("no such body in ../shared");
    header();
    for (g = 0; g < 2; g++) {
        cloth_mesh *mesh = NULL;
        cloth_desc  desc;
        char        file[64];
        (void)sprintf(file, "data/garments/%s_clean.obj", garment[g]);
        if (!CHECK(wardrobe(file, &mesh, &desc))) continue;
        for (i = 0; i < n && i < 5; i++) {
            skeleton_motion m;
            memset(&m, 0, sizeof m);
            (void)sprintf(file, "data/poses/%s.bvh", pose[i]);
            if (!CHECK(skeleton_bvh(&k, test_shared(file), m.turn[1]))) continue;
            memcpy(m.turn[2], m.turn[1], sizeof m.turn[1]);
            m.key = i ? 0.5 : 0.3;
            count(&w, garment[g], i ? pose[i] : "sit, 0.3 s",
                  dance(&k, &desc, &m, asked("STEPS", 90)));
        }
        cloth_mesh_destroy(NULL, mesh);
    }
    judge(&w);
    skeleton_free(&k);
}

static void shared_tshirt(void) { shared("body", "data/garments/tshirt_f_clean.obj", "T-shirt"); }
static void shared_trousers(void) {
    shared("body", "data/garments/trousers_f_clean.obj", "trousers");
}
static void shared_skirt(void) { shared("body", "data/garments/longskirt_f_clean.obj", "skirt"); }
static void shared_polo(void) {
    shared("body_m", "data/garments/poloshirt_m_clean.obj", "polo shirt");
}

/* The measure itself: a point in the chest, one outside, and one where two bodies overlap. */
static void measure(void) {
    static const double p[9] = {0, 1.2, 0, 0.6, 1.6, 0, 0, 1.0, 0.01};
    skeleton k;
    double   deep = 0;
    int      i;
    CHECK(skeleton_formula(&k, 0.03));
    CHECK_NEAR(skeleton_swallowed(&k, k.x, p, 3, 1, &deep), 200.0 / 3, 1e-9);
    CHECK(deep > 0.05 && deep < 0.12);
    for (i = 0; i < 3 * k.nf; i += 3) {     /* inside out: the number is -1 */
        const int f = k.faces[i];
        k.faces[i] = k.faces[i + 1], k.faces[i + 1] = f;
    }
    CHECK_NEAR(skeleton_swallowed(&k, k.x, p, 3, 1, &deep), 0, 0);
    skeleton_free(&k);
}

/* At rest as loaded, and a turn of the left arm by a right angle takes its hand there. */
static void poses(void) {
    skeleton_motion m;
    skeleton        k;
    double         *x, worst = 0;
    int             i, a, hand = 0;
    CHECK(skeleton_formula(&k, 0.03));
    x = (double *)malloc(3 * (size_t)k.nv * sizeof(double));
    if (!x) exit(2);
    memset(&m, 0, sizeof m);
    skeleton_pose(&k, &m, 0.3, x);
    for (i = 0; i < 3 * k.nv; i++) worst = fmax(worst, fabs(x[i] - k.x[i]));
    CHECK(worst < 1e-6);
    for (i = 0; i < k.nv; i++)
        if (k.x[3 * i] > k.x[3 * hand]) hand = i;
    for (i = 1; i < SKELETON_KEYS; i++)
        m.turn[i][k.driven[SKELETON_LEFT_ARM]][2] = 0.5 * 3.14159265358979;
    skeleton_pose(&k, &m, 0.5, x);
    for (a = 0; a < 2; a++) {               /* (dx, dy) goes to (-dy, dx) about the shoulder */
        const double *o = k.head[3], *r = k.x + 3 * hand;
        CHECK_NEAR(x[3 * hand + a], o[a] + (a ? r[0] - o[0] : o[1] - r[1]), 1e-3);
    }
    free(x);
    skeleton_free(&k);
}

/* The T-pose of ../shared lifts the hands of an A-pose to the height of the shoulders. */
static void tpose(void) {
    skeleton_motion m;
    skeleton        k;
    double         *x, low, level;
    int             i, hand = 0, arm = 0;
    if (!skeleton_shared(&k, "body", "default")) SKIP("no such body in ../shared");
    memset(&m, 0, sizeof m);
    x = (double *)malloc(3 * (size_t)k.nv * sizeof(double));
    if (!x) exit(2);
    CHECK(skeleton_bvh(&k, test_shared("data/poses/tpose.bvh"), m.turn[1]));
    skeleton_pose(&k, &m, 0.5, x);
    for (i = 0; i < k.nv; i++)
        if (k.x[3 * i] > k.x[3 * hand]) hand = i;
    while (arm + 1 < k.joints && strcmp(k.name[arm], "upperarm01.L")) arm++;
    low = k.x[3 * hand + 1] - k.head[arm][1], level = x[3 * hand + 1] - k.head[arm][1];
    printf("    left hand below the shoulder: %.2f m at rest, %.2f m in the T-pose\n", -low,
           -level);
    CHECK(low < -0.3 && fabs(level) < 0.1);
    free(x);
    skeleton_free(&k);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(measure);
    RUN(poses);
    RUN(tpose);
    RUN(shirt);
    RUN(skirt);
    if (test_full()) {
        RUN(shared_tshirt);
        RUN(shared_trousers);
        RUN(shared_skirt);
        RUN(shared_polo);
        RUN(shared_cut);
        RUN(shared_poses);
    }
    return TEST_END();
}
