/* shapes.h - closed triangle meshes for tests, appended one to another, and brute-force references.
 *   shape s = {0};  shape_sphere(&s, centre, 1.0, 16);  shape_box(&s, lo, hi, 2);  shape_free(&s);
 * Include after test.h, in one .c file per program. */
#ifndef CLOTH_TEST_SHAPES_H
#define CLOTH_TEST_SHAPES_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct shape {
    int     nv, nf;
    double *x;              /* [nv x 3] */
    int    *faces;          /* [nf x 3] */
} shape;

static inline void shape_free(shape *s) {
    free(s->x);
    free(s->faces);
    memset(s, 0, sizeof *s);
}

static inline void shape_room(shape *s, int nv, int nf) {
    s->x = (double *)realloc(s->x, 3 * (size_t)(s->nv + nv) * sizeof(double));
    s->faces = (int *)realloc(s->faces, 3 * (size_t)(s->nf + nf) * sizeof(int));
    if (!s->x || !s->faces) exit(2);
}

static inline int shape_vertex(shape *s, double x, double y, double z) {
    s->x[3 * s->nv] = x;
    s->x[3 * s->nv + 1] = y;
    s->x[3 * s->nv + 2] = z;
    return s->nv++;
}

static inline void shape_face(shape *s, int a, int b, int c) {
    s->faces[3 * s->nf] = a;
    s->faces[3 * s->nf + 1] = b;
    s->faces[3 * s->nf + 2] = c;
    s->nf++;
}

/* A grid of m x n vertices first + j m + i, closed in i and, when torus, in j; normals outward for
 * i from +x to +y, j upwards. */
static inline void shape_bands(shape *s, int first, int m, int n, int torus) {
    int i, j;
    for (j = 0; j < (torus ? n : n - 1); j++)
        for (i = 0; i < m; i++) {
            const int k = (i + 1) % m, l = (j + 1) % n;
            const int a = first + j * m + i, b = first + j * m + k, c = first + l * m + k;
            const int d = first + l * m + i;
            if ((i + j) % 2) {
                shape_face(s, a, b, c);
                shape_face(s, a, c, d);
            } else {
                shape_face(s, a, b, d);
                shape_face(s, b, c, d);
            }
        }
}

/* n - 1 rings of 2 n vertices on the sphere, and two poles: 4 n (n - 1) faces. */
static inline void shape_sphere(shape *s, const double *centre, double radius, int n) {
    const double pi = 3.14159265358979323846;
    const int    first = s->nv, m = 2 * n;
    int          i, j, south, north;
    shape_room(s, m * (n - 1) + 2, 4 * n * (n - 1));
    for (j = 1; j < n; j++)
        for (i = 0; i < m; i++) {
            const double a = pi * i / n, b = pi * j / n;
            shape_vertex(s, centre[0] + radius * sin(b) * cos(a),
                         centre[1] + radius * sin(b) * sin(a), centre[2] - radius * cos(b));
        }
    shape_bands(s, first, m, n - 1, 0);
    south = shape_vertex(s, centre[0], centre[1], centre[2] - radius);
    north = shape_vertex(s, centre[0], centre[1], centre[2] + radius);
    for (i = 0; i < m; i++) {
        shape_face(s, first + (i + 1) % m, first + i, south);
        shape_face(s, first + (n - 2) * m + i, first + (n - 2) * m + (i + 1) % m, north);
    }
}

/* Around the z axis: tube of radius b around a circle of radius a; m along, n around the tube. */
static inline void shape_torus(shape *s, double a, double b, int m, int n) {
    const double pi = 3.14159265358979323846;
    const int    first = s->nv;
    int          i, j;
    shape_room(s, m * n, 2 * m * n);
    for (j = 0; j < n; j++)
        for (i = 0; i < m; i++) {
            const double u = 2 * pi * i / m, v = 2 * pi * j / n, r = a - b * cos(v);
            shape_vertex(s, r * cos(u), r * sin(u), -b * sin(v));
        }
    shape_bands(s, first, m, n, 1);
}

/* An axis-aligned box of 12 faces. */
static inline void shape_box(shape *s, const double *lo, const double *hi) {
    static const int face[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4},
                                    {1, 5, 4}, {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6},
                                    {1, 3, 5}, {3, 7, 5}};
    const int first = s->nv;
    int       i;
    shape_room(s, 8, 12);
    for (i = 0; i < 8; i++)
        shape_vertex(s, i & 1 ? hi[0] : lo[0], i & 2 ? hi[1] : lo[1], i & 4 ? hi[2] : lo[2]);
    for (i = 0; i < 12; i++)
        shape_face(s, first + face[i][0], first + face[i][1], first + face[i][2]);
}

/* Turns the vertices from `first` on by a fixed odd rotation, so that nothing is aligned. */
static inline void shape_turn(shape *s, int first) {
    static const double q[4] = {0.6532814824381883, 0.2705980500730985, 0.4426437389431312,
                                0.5508932451326513};
    const double l = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    int          i, a;
    for (i = first; i < s->nv; i++) {
        double *p = s->x + 3 * i, u[3], t[3];
        for (a = 0; a < 3; a++) u[a] = q[1 + a] / l;
        t[0] = 2 * (u[1] * p[2] - u[2] * p[1]);
        t[1] = 2 * (u[2] * p[0] - u[0] * p[2]);
        t[2] = 2 * (u[0] * p[1] - u[1] * p[0]);
        u[0] = p[0] + q[0] / l * t[0] + (u[1] * t[2] - u[2] * t[1]);
        u[1] = p[1] + q[0] / l * t[1] + (q[3] / l * t[0] - q[1] / l * t[2]);
        u[2] = p[2] + q[0] / l * t[2] + (q[1] / l * t[1] - q[2] / l * t[0]);
        memcpy(p, u, sizeof u);
    }
}

/* Winding number of the mesh around p by solid angles, in long double, face `skip` left out. */
static inline long double shape_winding(const double *x, int nf, const int *faces,
                                        const double *p, int skip) {
    long double sum = 0;
    int         f, i, j;
    for (f = 0; f < nf; f++) {
        long double c[3][3], l[3], num, den;
        if (f == skip) continue;
        for (i = 0; i < 3; i++) {
            for (l[i] = 0, j = 0; j < 3; j++) {
                c[i][j] = (long double)x[3 * faces[3 * f + i] + j] - (long double)p[j];
                l[i] += c[i][j] * c[i][j];
            }
            l[i] = sqrtl(l[i]);
        }
        num = c[0][0] * (c[1][1] * c[2][2] - c[1][2] * c[2][1])
              + c[0][1] * (c[1][2] * c[2][0] - c[1][0] * c[2][2])
              + c[0][2] * (c[1][0] * c[2][1] - c[1][1] * c[2][0]);
        den = l[0] * l[1] * l[2];
        for (i = 0; i < 3; i++) {
            const long double *a = c[(i + 1) % 3], *b = c[(i + 2) % 3];
            den += l[i] * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
        }
        sum += atan2l(num, den);
    }
    return sum / (2 * 3.14159265358979323846264338327950288L);
}

#endif
