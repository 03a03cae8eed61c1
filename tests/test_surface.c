/* test_surface.c - closed surfaces [7.1]: winding numbers against solid angles in long double, on
 * the lattice of the corners and 1e-9 and 1e-13 from faces; nearest points by brute force; segments
 * through faces against integers and tests/exact.h; defects of meshes; parts inside of others.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. -I. test_surface.c -o test_surface -lm && ./test_surface
 * tier: quick */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim_collide.h"
#include "test.h"
#include "host.h"
#include "shapes.h"
#include "exact.h"

static unsigned long long seed = 1;

static double uniform(double a, double b) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return a + (b - a) * (double)(seed >> 11) / 9007199254740992.0;
}

static int below(int n) { return (int)uniform(0, n); }

typedef enum kind { BOX, TURNED, SPHERE, TORUS, OVERLAP, ROOM, KINDS } kind;

static void make(kind how, shape *s) {
    static const double lo[3] = {0, 0, 0}, hi[3] = {3, 2, 1}, a[3] = {0.1, 0.2, 0.3};
    static const double b[3] = {0.9, 0.5, 0.1};
    int f, t;
    memset(s, 0, sizeof *s);
    switch (how) {
    case BOX: shape_box(s, lo, hi); break;
    case TURNED: shape_box(s, lo, hi), shape_turn(s, 0); break;
    case SPHERE: shape_sphere(s, a, 1, 8); break;
    case TORUS: shape_torus(s, 1, 0.4, 24, 12); break;
    case OVERLAP: shape_sphere(s, a, 1, 8), shape_sphere(s, b, 1, 7); break;
    default:                                /* a sphere, and a smaller one inside out in it     */
        shape_sphere(s, a, 1, 8), f = s->nf, shape_sphere(s, a, 0.5, 6);
        for (; f < s->nf; f++)
            t = s->faces[3 * f], s->faces[3 * f] = s->faces[3 * f + 1], s->faces[3 * f + 1] = t;
    }
}

/* The surface of a mesh with its tree. */
static clothi_surface surface_of(const shape *s, clothi_bvh *tree) {
    clothi_surface out;
    if (clothi_bvh_faces(NULL, s->nv, s->x, s->nf, s->faces, tree)) exit(2);
    memset(&out, 0, sizeof out);
    out.x = s->x;
    out.faces = s->faces;
    out.tree = tree;
    return out;
}

/* --- winding numbers --- */

static void winding_at_random(void) {
    int how, i, a;
    for (how = 0; how < KINDS; how++) {
        shape          s;
        clothi_bvh     tree;
        clothi_surface u;
        int            wrong = 0, seen[5] = {0, 0, 0, 0, 0};
        make((kind)how, &s);
        u = surface_of(&s, &tree);
        for (i = 0; i < 2000; i++) {
            double      p[3];
            long double w;
            int         got;
            for (a = 0; a < 3; a++) p[a] = uniform(-1.5, 3.5);
            if (i & 1) for (a = 0; a < 3; a++) p[a] = s.x[3 * below(s.nv) + a];
            w = shape_winding(s.x, s.nf, s.faces, p, -1);
            if (fabsl(w - roundl(w)) > 1e-9L) continue;     /* on the surface */
            got = clothi_surface_winding(&u, p);
            wrong += got != (int)roundl(w);
            if (got >= -1 && got <= 3) seen[got + 1]++;
        }
        CHECK(wrong == 0);
        CHECK(seen[1] > 100 && seen[2] + seen[3] > 20 && (how != OVERLAP || seen[3] > 20));
        clothi_bvh_free(NULL, &tree);
        shape_free(&s);
    }
}

/* Beside faces, edges and corners: 1e-9 and 1e-13 along the normal, which the doubles still tell
 * from the surface; there the solid angle does too. */
static void winding_beside_faces(void) {
    int how, f, i, a, round;
    if (!test_long_double()) SKIP("long double is double");
    for (how = 0; how < KINDS; how++) {
        shape          s;
        clothi_bvh     tree;
        clothi_surface u;
        int            wrong = 0, asked = 0;
        make((kind)how, &s);
        u = surface_of(&s, &tree);
        for (f = 0; f < s.nf; f++)
            for (round = 0; round < 8; round++) {
                const int *v = s.faces + 3 * f;
                double     e1[3], e2[3], n[3], p[3], l, b[3], off = round & 1 ? 1e-9 : -1e-9;
                long double w;
                if (round & 4) off *= 1e-4;
                b[0] = round & 2 ? 1.0 / 3 : uniform(0.01, 0.5), b[1] = uniform(0.01, 0.4);
                b[2] = 1 - b[0] - b[1];
                clothi_sub3(s.x + 3 * v[1], s.x + 3 * v[0], e1);
                clothi_sub3(s.x + 3 * v[2], s.x + 3 * v[0], e2);
                clothi_cross3(e1, e2, n);
                l = sqrt(clothi_dot3(n, n));
                for (a = 0; a < 3; a++)
                    for (p[a] = off * n[a] / l, i = 0; i < 3; i++) p[a] += b[i] * s.x[3 * v[i] + a];
                w = shape_winding(s.x, s.nf, s.faces, p, -1);
                if (fabsl(w - roundl(w)) > 1e-3L) continue;
                asked++;
                wrong += clothi_surface_winding(&u, p) != (int)roundl(w);
            }
        CHECK(wrong == 0);
        CHECK(asked > 7 * s.nf);
        clothi_bvh_free(NULL, &tree);
        shape_free(&s);
    }
}

/* Every point of a lattice that holds the box's corners: rays through corners, edges and along
 * faces; on the surface the number is 0 or 1. */
static void winding_on_a_lattice(void) {
    shape          s;
    clothi_bvh     tree;
    clothi_surface u;
    int            i, j, k, wrong = 0;
    make(BOX, &s);
    u = surface_of(&s, &tree);
    for (i = -2; i <= 8; i++)
        for (j = -2; j <= 6; j++)
            for (k = -2; k <= 4; k++) {
                const int    in = i > 0 && i < 6 && j > 0 && j < 4 && k > 0 && k < 2;
                const int    out = i < 0 || i > 6 || j < 0 || j > 4 || k < 0 || k > 2;
                const double p[3] = {0.5 * i, 0.5 * j, 0.5 * k};
                const int    w = clothi_surface_winding(&u, p);
                wrong += in ? w != 1 : out ? w != 0 : w != 0 && w != 1;
            }
    CHECK(wrong == 0);
    clothi_bvh_free(NULL, &tree);
    shape_free(&s);
}

/* --- nearest points --- */

/* Distance in long double: the least over the face's plane, inside, and its sides. */
static long double face_distance(const shape *s, int f, const double *p) {
    const int  *v = s->faces + 3 * f;
    long double best = 1e300L, e[3], d[3], t, ee;
    int         i, a, round;
    for (i = 0; i < 3; i++) {
        const double *q = s->x + 3 * v[i], *r = s->x + 3 * v[(i + 1) % 3];
        for (ee = t = 0, a = 0; a < 3; a++) {
            e[a] = (long double)r[a] - (long double)q[a];
            d[a] = (long double)p[a] - (long double)q[a];
            ee += e[a] * e[a], t += e[a] * d[a];
        }
        t = fminl(1, fmaxl(0, t / ee));
        for (ee = 0, a = 0; a < 3; a++) ee += (d[a] - t * e[a]) * (d[a] - t * e[a]);
        best = fminl(best, ee);
    }
    /* a fine scan of the inside, then halved around the best: independent of normals */
    {
        long double b1 = 1.0L / 3, b2 = 1.0L / 3, h = 0.5L;
        for (round = 0; round < 60; round++, h *= 0.6L) {
            long double c1 = b1, c2 = b2, least = 1e300L;
            for (i = 0; i < 25; i++) {
                const long double g1 = b1 + h * (i % 5 - 2) / 2, g2 = b2 + h * (i / 5 - 2) / 2;
                if (g1 < 0 || g2 < 0 || g1 + g2 > 1) continue;
                for (ee = 0, a = 0; a < 3; a++) {
                    const long double x0 = (long double)s->x[3 * v[0] + a];
                    const long double y = x0 + g1 * ((long double)s->x[3 * v[1] + a] - x0) +
                                          g2 * ((long double)s->x[3 * v[2] + a] - x0);
                    ee += (y - (long double)p[a]) * (y - (long double)p[a]);
                }
                if (ee < least) least = ee, c1 = g1, c2 = g2;
            }
            b1 = c1, b2 = c2;
            best = fminl(best, least);
        }
    }
    return sqrtl(best);
}

static void nearest_is_brute_force(void) {
    int how, i, a, k, f;
    for (how = BOX; how < ROOM; how += 2) {
        shape          s;
        clothi_bvh     tree;
        clothi_surface u;
        unsigned char *odd;
        make((kind)how, &s);
        u = surface_of(&s, &tree);
        odd = (unsigned char *)calloc((size_t)s.nf, 1);
        if (!odd) exit(2);
        for (f = 1; f < s.nf; f += 2) odd[f] = 1;
        for (i = 0; i < 12; i++) {
            double      p[3], d2 = 1e300, b[3], y;
            const int   leave_out = i & 1;
            long double best = 1e300L, off = 0;
            for (a = 0; a < 3; a++) p[a] = uniform(-1.5, 3.5);
            for (f = 0; f < s.nf; f += 1 + leave_out) best = fminl(best, face_distance(&s, f, p));
            u.skip = leave_out ? odd : NULL;
            f = clothi_surface_nearest(&u, p, &d2, b);
            CHECK(f >= 0 && !(leave_out && f % 2));
            CHECK_NEAR(sqrt(d2), (double)best, 1e-9);
            CHECK_NEAR(b[0] + b[1] + b[2], 1, 1e-14);
            for (a = 0; a < 3; a++) {
                for (y = 0, k = 0; k < 3; k++) y += b[k] * s.x[3 * s.faces[3 * f + k] + a];
                off += (long double)((y - p[a]) * (y - p[a]));
            }
            CHECK_NEAR(sqrtl(off), (double)best, 1e-9);
            d2 *= 0.99;
            CHECK(clothi_surface_nearest(&u, p, &d2, b) == -1);
        }
        free(odd);
        clothi_bvh_free(NULL, &tree);
        shape_free(&s);
    }
}

/* --- segments --- */

static int det_sign(const double *a, const double *b, const double *c, const double *d) {
    const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    const double w[3] = {d[0] - a[0], d[1] - a[1], d[2] - a[2]};
    const double t = w[0] * (u[1] * v[2] - u[2] * v[1]) + w[1] * (u[2] * v[0] - u[0] * v[2]) +
                     w[2] * (u[0] * v[1] - u[1] * v[0]);
    return (t > 0) - (t < 0);
}

static int pierced_face(const shape *s, int f, const double *p, const double *q) {
    const int *v = s->faces + 3 * f;
    return clothi_surface_pierced(p, q, s->x + 3 * v[0], s->x + 3 * v[1], s->x + 3 * v[2]);
}

/* Small integers: all ways to touch; the determinants of the test are exact there. The segment is a
 * triangle without area for exact.h, which counts ends in the plane that we do not. */
static void pierced_on_a_lattice(void) {
    static const int f[3] = {0, 1, 2}, g[3] = {3, 4, 5};
    int              i, k, wrong = 0, hits = 0, touches = 0;
    for (i = 0; i < 20000; i++) {
        double x[18];
        int    sp, sq, want, got, span = 2 + i % 4;
        for (k = 0; k < 15; k++) x[k] = below(span);
        memcpy(x + 15, x + 12, 3 * sizeof *x);
        sp = det_sign(x, x + 3, x + 6, x + 9), sq = det_sign(x, x + 3, x + 6, x + 12);
        want = sp == sq ? 0 : exact_triangles(x, f, g) * (sq > sp ? 1 : -1);
        got = clothi_surface_pierced(x + 9, x + 12, x, x + 3, x + 6);
        wrong += got != want;
        wrong += clothi_surface_pierced(x + 12, x + 9, x, x + 3, x + 6) != -want;
        hits += got != 0, touches += got != 0 && sp * sq == 0;
    }
    CHECK(wrong == 0);
    CHECK(hits > 500 && touches > 100);
}

/* Segments through points of an edge or of a face, rounded: exact.h says on which side they are. */
static void pierced_by_a_rounding(void) {
    static const int f[3] = {0, 1, 2}, g[3] = {3, 4, 5};
    int              i, k, wrong = 0, hits = 0;
    for (i = 0; i < 3000; i++) {
        double x[18], b = i % 3 ? uniform(0, 1) : 0.5, c = i % 2 ? 0 : uniform(0, 1 - b);
        for (k = 0; k < 9; k++) x[k] = uniform(-1, 1);
        for (k = 0; k < 3; k++) {
            const double at = x[k] + b * (x[3 + k] - x[k]) + c * (x[6 + k] - x[k]);
            x[9 + k] = uniform(-1, 1);
            x[12 + k] = x[15 + k] = i % 5 ? 2 * at - x[9 + k] : at;
        }
        k = clothi_surface_pierced(x + 9, x + 12, x, x + 3, x + 6) != 0;
        wrong += k != exact_triangles(x, f, g);
        hits += k;
    }
    CHECK(wrong == 0);
    CHECK(hits > 500 && hits < 2900);
}

/* What the faces on the way say together is the difference of the winding numbers; a walk through
 * the tree meets them all, each once. */
static void segments_through_meshes(void) {
    int how, i, a, f;
    for (how = 0; how < KINDS; how++) {
        shape          s;
        clothi_bvh     tree;
        clothi_surface u;
        int            wrong = 0, hits = 0;
        make((kind)how, &s);
        u = surface_of(&s, &tree);
        for (i = 0; i < 500; i++) {
            double      p[3], q[3], box[6];
            int         sum = 0, left = 0;
            clothi_bvh_walk w;
            for (a = 0; a < 3; a++) p[a] = uniform(-1.5, 3.5), q[a] = uniform(-1.5, 3.5);
            clothi_swept_boxes(1, p, q, 0, box);
            for (f = 0; f < s.nf; f++) {
                const int way = pierced_face(&s, f, p, q);
                left += way != 0;
                sum += way;
            }
            hits += left;
            w.tree = &tree, w.box = box, w.node = 1, w.at = w.end = 0;
            while ((f = clothi_bvh_next(&w)) >= 0) left -= pierced_face(&s, f, p, q) != 0;
            wrong += left || clothi_surface_winding(&u, p) - clothi_surface_winding(&u, q) != sum;
        }
        CHECK(wrong == 0);
        CHECK(hits > 50);
        clothi_bvh_free(NULL, &tree);
        shape_free(&s);
    }
}

/* --- meshes --- */

static clothi_surface_defects defects_of(const shape *s, int nf, unsigned char *closed) {
    clothi_surface_defects d;
    CHECK(clothi_surface_check(NULL, s->nv, nf, s->x, s->faces, closed, &d) == CLOTH_OK);
    return d;
}

static void turn_faces(shape *s, int from, int to) {
    int f, t;
    for (f = from; f < to; f++)
        t = s->faces[3 * f], s->faces[3 * f] = s->faces[3 * f + 1], s->faces[3 * f + 1] = t;
}

/* The first face of a part that is inside out, beside a larger or a smaller part that is not, is
 * named; the volume is that of all. A cavity is such a part. */
static void looks_inwards(void) {
    static const double    lo[3] = {0, 0, 0}, hi[3] = {3, 2, 1}, at[3] = {9, 0, 0};
    unsigned char          closed[1024];
    clothi_surface_defects d;
    shape                  s;
    double                 ball;
    int                    outer;
    memset(&s, 0, sizeof s);
    shape_box(&s, lo, hi), shape_sphere(&s, at, 0.5, 5);
    d = defects_of(&s, s.nf, closed), ball = d.volume - 6;
    CHECK(d.inward == -1 && ball > 0.3 && ball < 0.5236);
    turn_faces(&s, 12, s.nf);
    d = defects_of(&s, s.nf, closed);
    CHECK(d.inward == 12 && fabs(d.volume - 6 + ball) < 1e-12);
    turn_faces(&s, 0, 12);
    d = defects_of(&s, s.nf, closed);
    CHECK(d.inward == 0 && fabs(d.volume + 6 + ball) < 1e-12);
    turn_faces(&s, 12, s.nf);
    d = defects_of(&s, s.nf, closed);
    CHECK(d.inward == 0 && fabs(d.volume + 6 - ball) < 1e-12);
    shape_free(&s);
    make(SPHERE, &s), outer = s.nf;
    shape_free(&s);
    make(ROOM, &s);
    d = defects_of(&s, s.nf, closed);
    CHECK(d.inward == outer && d.volume > 0);
    shape_free(&s);
}

static void defects(void) {
    static const double    lo[3] = {0, 0, 0}, hi[3] = {1, 1, 1}, far_lo[3] = {2, 0, 0};
    static const double    far_hi[3] = {3, 1, 1};
    shape                  s;
    unsigned char          closed[64];
    clothi_surface_defects d;
    int                    f, t, n;
    memset(&s, 0, sizeof s);
    shape_box(&s, lo, hi), shape_box(&s, far_lo, far_hi);
    d = defects_of(&s, 24, closed);
    CHECK(d.open == -1 && d.turned == -1 && d.branch == -1);
    d = defects_of(&s, 23, closed);                         /* a hole in the second */
    CHECK(d.open >= 36 && d.turned == -1 && d.branch == -1);
    for (n = 0, f = 0; f < 23; f++) n += closed[f] == (f < 12);
    CHECK(n == 23);
    t = s.faces[3], s.faces[3] = s.faces[4], s.faces[4] = t;        /* face 1 turned */
    d = defects_of(&s, 24, closed);
    CHECK(d.open >= 0 && d.open == d.turned && d.branch == -1 && d.open / 3 <= 1);
    CHECK(!closed[0] && !closed[11] && closed[12] && closed[23]);
    t = s.faces[3], s.faces[3] = s.faces[4], s.faces[4] = t;
    for (f = 36; f < 72; f++)               /* the boxes now share an edge, 3 and 7, 8 and 12 */
        s.faces[f] = s.faces[f] == 8 ? 3 : s.faces[f] == 12 ? 7 : s.faces[f];
    d = defects_of(&s, 24, closed);
    CHECK(d.open == -1 && d.turned == -1 && d.branch >= 0);
    CHECK(closed[0] && closed[23]);
    shape_free(&s);
}

/* Faces of open components have no inside. */
static void open_parts_do_not_wind(void) {
    static const double lo[3] = {0, 0, 0}, hi[3] = {1, 1, 1}, p[3] = {0.4, 0.3, 0.2};
    static const double out_lo[3] = {-1, -1, -1}, out_hi[3] = {2, 2, 2};
    shape                  s;
    unsigned char          closed[32];
    clothi_bvh             tree;
    clothi_surface         u;
    clothi_surface_defects d;
    memset(&s, 0, sizeof s);
    shape_box(&s, lo, hi), shape_box(&s, out_lo, out_hi);
    s.nf--;
    u = surface_of(&s, &tree);
    CHECK(clothi_surface_check(NULL, s.nv, s.nf, s.x, s.faces, closed, &d) == CLOTH_OK);
    CHECK(d.open >= 0);
    u.closed = closed;
    CHECK(clothi_surface_winding(&u, p) == 1);
    clothi_bvh_free(NULL, &tree);
    shape_free(&s);
}

/* Covered faces have 1 or more outside and meet no other; those of the others that have are cut. */
static void parts_inside_of_others(void) {
    int how, f, g, i, a;
    for (how = SPHERE; how < KINDS; how++) {
        shape          s;
        clothi_bvh     tree;
        clothi_surface u;
        unsigned char  covered[2000];
        int            wrong = 0, count = 0;
        make((kind)how, &s);
        if (how == TORUS) {                 /* one that lies inside of another, as a whole */
            const double centre[3] = {1, 0, 0};
            shape_sphere(&s, centre, 0.2, 6);
        }
        u = surface_of(&s, &tree);
        if (!CHECK(s.nf <= 2000)) exit(2);
        CHECK(clothi_surface_covered(NULL, &u, s.nf, covered) == CLOTH_OK);
        for (f = 0; f < s.nf; f++) {
            const int *v = s.faces + 3 * f;
            double     p[3], e1[3], e2[3], n[3];
            int        inside, cut = 0;
            clothi_sub3(s.x + 3 * v[1], s.x + 3 * v[0], e1);
            clothi_sub3(s.x + 3 * v[2], s.x + 3 * v[0], e2);
            clothi_cross3(e1, e2, n);
            for (a = 0; a < 3; a++)
                for (p[a] = 1e-9 * n[a] / sqrt(clothi_dot3(n, n)), i = 0; i < 3; i++)
                    p[a] += s.x[3 * v[i] + a] / 3;
            inside = shape_winding(s.x, s.nf, s.faces, p, -1) > 0.5L;
            count += covered[f];
            if (!inside && !covered[f]) continue;
            for (g = 0; g < s.nf; g++) cut |= exact_triangles(s.x, v, s.faces + 3 * g);
            wrong += covered[f] ? !inside || cut : !cut;
        }
        CHECK(wrong == 0);
        CHECK(how == OVERLAP || how == TORUS ? count > 20 : count == 0);
        clothi_bvh_free(NULL, &tree);
        shape_free(&s);
    }
}

static void out_of_memory(void) {
    shape                  s;
    clothi_bvh             tree;
    clothi_surface         u;
    unsigned char          covered[2000];
    clothi_surface_defects d;
    cloth_status           status = CLOTH_ERR_MEMORY;
    host                   h;
    cloth_hooks            hooks = host_hooks(&h);
    int                    n;
    make(OVERLAP, &s);
    u = surface_of(&s, &tree);
    for (n = 1; status != CLOTH_OK && n < 100; n++) {
        h.calls = 0, h.fail_at = n;
        status = clothi_surface_check(&hooks, s.nv, s.nf, s.x, s.faces, covered, &d);
        if (status == CLOTH_OK) status = clothi_surface_covered(&hooks, &u, s.nf, covered);
        CHECK(status == CLOTH_OK || status == CLOTH_ERR_MEMORY);
        CHECK(h.live == 0);
    }
    CHECK(n > 4 && n < 100);
    clothi_bvh_free(NULL, &tree);
    shape_free(&s);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(winding_at_random);
    RUN(winding_beside_faces);
    RUN(winding_on_a_lattice);
    RUN(nearest_is_brute_force);
    RUN(pierced_on_a_lattice);
    RUN(pierced_by_a_rounding);
    RUN(segments_through_meshes);
    RUN(looks_inwards);
    RUN(defects);
    RUN(open_parts_do_not_wind);
    RUN(parts_inside_of_others);
    RUN(out_of_memory);
    return TEST_END();
}
