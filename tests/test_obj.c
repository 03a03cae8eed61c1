/* test_obj.c - numbers and OBJ text, in and out.
 *   cc -std=c99 -O2 -ffp-contract=off -I.. test_obj.c -o test_obj -lm && ./test_obj */
#define CLOTHSIM_IMPLEMENTATION
#include "clothsim.h"
#include "test.h"
#include "host.h"
#include <locale.h>

static uint64_t seed = 1;

static uint64_t random_bits(void) {
    uint64_t z = seed += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static int same_bits(double a, double b) { return memcmp(&a, &b, sizeof a) == 0; }

static double from_bits(uint64_t bits) {
    double a;
    memcpy(&a, &bits, sizeof a);
    return a;
}

/* --- numbers --- */

static void read_as_strtod(const char *text) {
    double mine = 0;
    if (!CHECK(clothi_parse_double(text, strlen(text), &mine))) printf("%s\n", text);
    if (!CHECK(same_bits(mine, strtod(text, NULL))))
        printf("%.60s: %.17g, strtod %.17g\n", text, mine, strtod(text, NULL));
}

static void number_hard_cases(void) {
    static const char *const text[] = {
        "0", "-0", "0.0e999999999999999999999", "1", "-1.5", "1.", ".5", "+.5e+1", "0.1", "0.3",
        "00000000000000000000000000000012", "0.000000000000000000000000000000012",
        "123456789012345678901234567890", "9007199254740992", "9007199254740993",
        "9007199254740993.0000000000000000000000000000000000000000000001",
        "9007199254740994.99999999999999999999999999999999999999999999", "9007199254740995",
        "5e-324", "4.9406564584124654e-324", "2.4703282292062327e-324",
        "2.4703282292062328e-324", "2.47032822920623272e-324", "1e-323", "7.4e-324", "1e-324",
        "2.2250738585072014e-308", "2.2250738585072011e-308", "2.2250738585072012e-308",
        "2.22507385850720113605740979670913197593481954635164564802342610972482222202107e-308",
        "1.7976931348623157e308", "1.7976931348623158e308", "1.797693134862315807e308",
        "1.7976931348623159e308", "1e308", "8.98846567431158e307", "1e-400", "1e400", "-1e400",
        "1e-99999999999999999999", "1e99999999999999999999", "6.02214076e23", "1e22", "1e23",
        "8.5e22", "1e15", "123456789012345e22", "123456789012345e23", "999999999999999e-22",
        "5497558138880.0000000000000001", "4503599627370496.5", "4503599627370497.5",
        "1.00000000000000011102230246251565404236316680908203125",
        "1.00000000000000011102230246251565404236316680908203124",
        "1.00000000000000011102230246251565404236316680908203126", "3.518437208883201171875e13"};
    static const char *const bad[] = {"", "-", "+", ".", "e5", "1e", "1e+", "1e-", "nan", "NaN",
                                      "inf", "-inf", "infinity", "0x10", "1,5", "1.2.3", "1 ",
                                      " 1", "1f", "--1", "1e5.5", "1_0", "\xd9\xa1"};
    double a;
    size_t i;
    for (i = 0; i < sizeof text / sizeof *text; i++) read_as_strtod(text[i]);
    for (i = 0; i < sizeof bad / sizeof *bad; i++)
        if (!CHECK(!clothi_parse_double(bad[i], strlen(bad[i]), &a))) printf("'%s'\n", bad[i]);
}

/* 2^-1075 exactly (751 digits): halfway between 0 and the least double, ties to even: 0; and the
 * same with a last digit more: up. Likewise odd multiples. */
static void number_subnormal_ties(void) {
    char digits[1200], text[1300];
    int  multiple, n, i, carry;
    for (multiple = 1; multiple < 8; multiple += 2) {
        unsigned char d[1200];
        n = 1;
        memset(d, 0, sizeof d);
        d[0] = (unsigned char)multiple;                 /* least first: multiple * 5^1075 */
        for (i = 0; i < 1075; i++) {
            int k;
            for (carry = 0, k = 0; k < n; k++) {
                carry += 5 * d[k];
                d[k] = (unsigned char)(carry % 10);
                carry /= 10;
            }
            while (carry) {
                d[n++] = (unsigned char)(carry % 10);
                carry /= 10;
            }
        }
        for (i = 0; i < n; i++) digits[i] = (char)('0' + d[n - 1 - i]);
        digits[n] = '\0';
        snprintf(text, sizeof text, "%se-1075", digits);
        read_as_strtod(text);
        {
            double a = 1;
            CHECK(clothi_parse_double(text, strlen(text), &a));
            CHECK(same_bits(a, from_bits((uint64_t)(multiple == 1 ? 0 : multiple == 3 ? 2
                                                    : multiple == 5 ? 2 : 4))));
        }
        snprintf(text, sizeof text, "%s000000000000000000001e-1096", digits);
        read_as_strtod(text);
        digits[n - 1]--;
        snprintf(text, sizeof text, "%se-1075", digits);
        read_as_strtod(text);
    }
}

/* midpoints of random neighbours, exactly, and a digit beside them */
static void number_midpoints(void) {
    char text[1600];
    int  i, n;
    for (i = 0; i < (test_full() ? 40000 : 1000); i++) {
        const uint64_t bits = random_bits() & 0x7fffffffffffffffu;
        const double   a = from_bits(bits), b = from_bits(bits + 1);
        long double    mid;
        if (!clothi_finite(a) || !clothi_finite(b)) continue;
        mid = ((long double)a + (long double)b) / 2;  /* exact: 64 bits of mantissa */
        n = snprintf(text, sizeof text, "%.*Le", 800, mid);
        if (n < 0 || n >= (int)sizeof text) continue;
        read_as_strtod(text);
        text[500]++;
        if (text[500] >= '0' && text[500] <= '9') read_as_strtod(text);
    }
}

static void number_random_texts(void) {
    char text[600];
    int  i, k;
    for (i = 0; i < (test_full() ? 1000000 : 50000); i++) {
        const int digits = 1 + (int)(random_bits() % (i % 100 ? 25 : 400));
        const int point = (int)(random_bits() % (unsigned)(digits + 1));
        int       n = 0;
        for (k = 0; k < digits; k++) {
            if (k == point) text[n++] = '.';
            text[n++] = (char)('0' + (int)(random_bits() % 10));
        }
        if (i % 3)
            snprintf(text + n, sizeof text - (size_t)n, "e%d",
                     (int)(random_bits() % (i % 3 == 1 ? 40 : 700)) - (i % 3 == 1 ? 20 : 350));
        else text[n] = '\0';
        read_as_strtod(text);
    }
}

/* 400 000 digits, zeros before and after the point, exponents that undo them */
static void number_long_texts(void) {
    const size_t n = 400000;
    char        *text = (char *)malloc(2 * n + 64);
    double       a = 0;
    memset(text, '0', n);
    memcpy(text + n, "25", 3);
    CHECK(clothi_parse_double(text, strlen(text), &a) && a == 25);
    memset(text, '0', n);
    text[1] = '.';
    memcpy(text + n, "25e400000", 10);
    CHECK(clothi_parse_double(text, strlen(text), &a) && a == 25);
    memset(text, '0', n);
    text[0] = '7';
    memcpy(text + n, "e-399999", 9);
    CHECK(clothi_parse_double(text, strlen(text), &a) && a == 7);
    memset(text, '3', n);
    text[0] = '.';
    text[n] = '\0';
    CHECK(clothi_parse_double(text, strlen(text), &a) && a == 1.0 / 3);
    memcpy(text, "9007199254740993.", 17);              /* a tie but for the 400 000th digit */
    memset(text + 17, '0', n);
    memcpy(text + 17 + n, "1", 2);
    CHECK(clothi_parse_double(text, strlen(text), &a) && a == 9007199254740994.0);
    text[17 + n] = '0';
    CHECK(clothi_parse_double(text, strlen(text), &a) && a == 9007199254740992.0);
    free(text);
}

static size_t write_number(double a, char *text) {
    clothi_sink sink;
    sink.buf = text;
    sink.capacity = 64;
    sink.n = 0;
    clothi_sink_number(&sink, a, 17, -4, 17);
    text[sink.n] = '\0';
    return sink.n;
}

static void number_written(void) {
    static const struct {
        double      a;
        const char *text;
    } want[] = {{0.0, "0"}, {-0.0, "-0"}, {1.0, "1"}, {-0.5, "-0.5"}, {0.1, "0.1"},
                {100.0, "100"}, {1e16, "10000000000000000"}, {1e17, "1e17"},
                {123456.75, "123456.75"},
                {1e-5, "0.00001"}, {1.5e-7, "1.5e-7"}, {5e-324, "5e-324"},
                {1.7976931348623157e308, "1.7976931348623157e308"},
                {2.2250738585072014e-308, "2.2250738585072014e-308"},
                {1.0 / 3, "0.3333333333333333"}, {9007199254740993.0, "9007199254740992"},
                {1e23, "1e23"}, {8.41e21, "8.41e21"}, {9.5367431640625e-07, "9.5367431640625e-7"}};
    char   text[64];
    size_t i;
    for (i = 0; i < sizeof want / sizeof *want; i++) {
        write_number(want[i].a, text);
        if (!CHECK(strcmp(text, want[i].text) == 0)) printf("%s, want %s\n", text, want[i].text);
    }
}

/* significant digits of a text */
static int digits_of(const char *text) {
    int n = 0, zeros = 0;
    for (; *text && *text != 'e'; text++)
        if (*text >= '0' && *text <= '9') {
            if (n == 0 && *text == '0') continue;
            n++;
            zeros = *text == '0' ? zeros + 1 : 0;
        }
    return n - zeros;
}

/* every double reads back; none is written longer than the shortest %.{n}e that reads back */
static void number_round_trip(void) {
    char text[64], other[64];
    int  i, n, longer = 0;
    for (i = 0; i < (test_full() ? 3000000 : 100000); i++) {
        double a = from_bits(random_bits()), b = 0;
        if (i % 4 == 1) a = from_bits(random_bits() >> (11 + i % 53) | (uint64_t)(i & 1) << 63);
        if (i % 4 == 2) a = ldexp(1.0, i % 2098 - 1074);
        if (i % 4 == 3) a = (double)(int64_t)random_bits() / 1e9 * 1e-9;
        if (!clothi_finite(a)) continue;
        write_number(a, text);
        if (!CHECK(clothi_parse_double(text, strlen(text), &b) && same_bits(a, b)) ||
            !CHECK(same_bits(a, strtod(text, NULL))))
            printf("%.17g written as %s\n", a, text);
        if (i % 16 > 3 || a == 0) continue;
        for (n = 1; n <= 17; n++) {
            snprintf(other, sizeof other, "%.*e", n - 1, a);
            if (same_bits(strtod(other, NULL), a)) break;
        }
        longer += digits_of(text) > n;
    }
    CHECK(longer == 0);
}

/* --- OBJ text --- */

static cloth_mesh *parse(const char *text, const cloth_obj_options *opt) {
    host        h;
    cloth_mesh *m = NULL;
    cloth_hooks hooks = host_hooks(&h);
    hooks.allocator.alloc = NULL;
    hooks.allocator.free = NULL;
    if (!CHECK(cloth_obj_parse(&hooks, text, strlen(text), opt, &m) == CLOTH_OK))
        printf("%s\n", h.text);
    return m;
}

static void expect_faces(const char *text, int nf, const int *faces) {
    cloth_mesh *m = parse(text, NULL);
    if (!m) return;
    CHECK(m->nf == nf);
    if (m->nf == nf) CHECK(memcmp(m->faces, faces, 3 * sizeof *faces * (size_t)nf) == 0);
    cloth_mesh_destroy(NULL, m);
}

#define V4 "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"

static void obj_forms(void) {
    static const int one[] = {0, 1, 2}, quad[] = {0, 1, 2, 0, 2, 3};
    expect_faces(V4 "f 1 2 3\n", 1, one);
    expect_faces(V4 "f 1 2 3", 1, one);
    expect_faces(V4 "f 1 2 3 4\n", 2, quad);
    expect_faces(V4 "f -4 -3 -2 -1\n", 2, quad);
    expect_faces("v 0 0 0\nv 1 0 0\nv 1 1 0\nf -3 -2 -1\nv 0 1 0\n", 1, one);
    expect_faces(V4 "f 1// 2// 3//\n", 1, one);
    expect_faces(V4 "vn 0 0 1\nf 1//1 2//1 3//1 4//1\n", 2, quad);
    expect_faces(V4 "vt 0 0\nf 1/1 2/1 3/1 4/1\n", 2, quad);
    expect_faces(V4 "vt 0 0\nf 1/1/ 2/1/ 3/-1/ 4/1\n", 2, quad);
    expect_faces(V4 "vt 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/-1/-1 4/1/1\n", 2, quad);
    expect_faces("f 1 2 3 4\n" V4, 2, quad);                        /* before their vertices */
    expect_faces("# c\r\nv 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\n\r\nf 1 2 3\r\n", 1, one);
    expect_faces("v 0 0 0\rv 1 0 0\rv 1 1 0\rf 1 2 3\r", 1, one);
    expect_faces("\t v\t0  0 0 # first\n v 1 0 0 1.0\nv 1 1 0 0.5 nan nan\nf 1 2 3#c\n", 1, one);
    expect_faces("\xef\xbb\xbf" V4 "f -4 2 3\n", 1, one);
    expect_faces("v 0 \\\n0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\r\n3 \\\r4\n", 2, quad);
    expect_faces("mtllib a.mtl\no x\ng y z\ns off\nusemtl m\nl 1 2\np 1\nfoo \\\nf 9 9 9\n# \\\n" V4
                 "vp 1 2\nf -4 +2 +3\n", 1, one);
}

static void obj_values(void) {
    cloth_obj_options opt = cloth_obj_options_default();
    cloth_mesh       *m;
    opt.scale = 0.01;
    opt.pattern_scale = 2;
    m = parse("v 100 -2e2 .5\nv 1 0 0\nv 1 1 0\nvt .25 .5\nvt 1 0 9\nvt 1\nf 1/1 2/3 3/2\n", &opt);
    if (!m) return;
    CHECK(m->x[0] == 1 && m->x[1] == -2 && m->x[2] == 0.005);
    CHECK(m->X != NULL && m->X[0] == 0.5 && m->X[1] == 1 && m->X[2] == 2 && m->X[3] == 0 &&
          m->X[4] == 2 && m->X[5] == 0);
    CHECK(m->part == NULL && m->npart == 0 && m->nr == 3);
    cloth_mesh_destroy(NULL, m);
}

/* Indices from 1 and from the last so far name the same: a face read before the last vt too. */
static void obj_indices(void) {
    static const char *const face[3][2] = {{"1/1 2/2 3/3", "1/2 3/3 4/4"},
                                           {"-4/-3 -3/-2 -2/-1", "-4/-3 -2/-2 -1/-1"},
                                           {"1/-3 -3/2 3/-1", "-4/2 3/-2 -1/4"}};
    static const double      X[12] = {0, 0, 1, 0, 1, 1, 1, 0, 1, 1, 7, 7};
    static const int         faces[6] = {0, 1, 2, 0, 2, 3};
    cloth_obj_options        opt = cloth_obj_options_default();
    char                     text[256];
    int                      k;
    opt.pattern_scale = 1;
    for (k = 0; k < 3; k++) {
        cloth_mesh *m;
        snprintf(text, sizeof text, "%svt 0 0\nvt 1 0\nvt 1 1\nf %s\nvt 7 7\nf %s\n", V4,
                 face[k][0], face[k][1]);
        m = parse(text, &opt);
        if (!CHECK(m && m->nf == 2 && m->X)) return;
        CHECK(memcmp(m->faces, faces, sizeof faces) == 0 && memcmp(m->X, X, sizeof X) == 0);
        cloth_mesh_destroy(NULL, m);
    }
}

/* two triangles whose shared edge is a seam at vertex 2 only */
static void obj_seams(void) {
    cloth_mesh *m = parse(V4 "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 5 5\n"
                          "f 1/1 2/2 3/3\nf 1/1 3/5 4/4\n", NULL);
    static const int    vertex[] = {0, 1, 2, 2, 3}, faces[] = {0, 1, 2, 0, 3, 4};
    static const double vt[] = {0, 0, 1, 0, 1, 1, 5, 5, 0, 1};
    if (!m) return;
    CHECK(m->nr == 5 && m->X == NULL);
    if (m->nr == 5) {
        CHECK(memcmp(m->render_vertex, vertex, sizeof vertex) == 0);
        CHECK(memcmp(m->render_faces, faces, sizeof faces) == 0);
        CHECK(memcmp(m->vt, vt, sizeof vt) == 0);
    }
    cloth_mesh_destroy(NULL, m);
    m = parse(V4 "vt 3 4\nf 1 2 3\nf 1/1 3 4\n", NULL);                 /* some without vt */
    if (!m) return;
    CHECK(m->nr == 5 && m->render_vertex[1] == 0 && m->vt[2] == 3 && m->vt[0] == 0);
    cloth_mesh_destroy(NULL, m);
}

static void obj_parts(void) {
    static const char text[] = V4 "f 1 2 3\no a b \nf 1 2 3\ng u\ng v\nf 1 2 3 4\no c\nf 1 2 3\n"
                                  "o a b # comment\ng u\nf 2 3 4\no never\n";
    static const int  objects[] = {0, 1, 1, 1, 2, 1}, groups[] = {0, 0, 1, 1, 1, 2};
    cloth_obj_options opt = cloth_obj_options_default();
    cloth_mesh       *m;
    char              many[8192];
    int               n, k;
    opt.parts = CLOTH_OBJ_PARTS_OBJECTS;
    m = parse(text, &opt);
    if (m) CHECK(m->nf == 6 && m->npart == 3 && memcmp(m->part, objects, sizeof objects) == 0);
    cloth_mesh_destroy(NULL, m);
    opt.parts = CLOTH_OBJ_PARTS_GROUPS;
    m = parse(text, &opt);
    if (m) CHECK(m->nf == 6 && m->npart == 3 && memcmp(m->part, groups, sizeof groups) == 0);
    cloth_mesh_destroy(NULL, m);
    n = snprintf(many, sizeof many, "%s", V4);          /* x, xx, xxx, .. and back             */
    for (k = 1; k < 120; k++)
        n += snprintf(many + n, sizeof many - (size_t)n, "g %.*s\nf 1 2 3\n", k < 60 ? k : 120 - k,
                      "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx");
    m = parse(many, &opt);
    if (m) {
        CHECK(m->nf == 119 && m->npart == 60);
        for (k = 1; k < 120; k++) CHECK(m->part[k - 1] == (k <= 60 ? k : 120 - k) - 1);
    }
    cloth_mesh_destroy(NULL, m);
}

/* The names, each ended by 0, are as many as there are parts, whatever bytes a line has. */
static void obj_part_names(void) {
    static const char text[] = V4 "o a\0b\nf 1 2 3\no c\nf 2 3 4\no d \\\n e\nf 1 2 4\n"
                                  "o \\\r\nf g\nf 1 3 4\no a\nf 4 1 2\n";
    static const char names[] = "a\0c\0d\0f g";
    cloth_obj_options opt = cloth_obj_options_default();
    cloth_mesh       *m = NULL;
    opt.parts = CLOTH_OBJ_PARTS_OBJECTS;
    CHECK(cloth_obj_parse(NULL, text, sizeof text - 1, &opt, &m) == CLOTH_OK);
    if (m) CHECK(m->npart == 4 && m->part[4] == 0 && memcmp(m->names, names, sizeof names) == 0);
    cloth_mesh_destroy(NULL, m);
}

static void obj_refusals(void) {
    static const struct {
        const char  *text;
        const char  *sentence;
        int          pattern;       /* 1: vt are the pattern, 2: times 1e300; 3: v times 1e10 */
        cloth_status status;
    } bad[] = {
        {"", "no vertex", 0, CLOTH_ERR_PARSE},
        {"\n\n", "no vertex", 0, CLOTH_ERR_PARSE},
        {V4, "no face", 0, CLOTH_ERR_PARSE},
        {"v 0 0\nf 1 1 1\n", "line 1: v has 2 numbers but needs 3", 0, CLOTH_ERR_PARSE},
        {"\n\nv 0 0 x\n", "line 3: v: 'x' is not a number", 0, CLOTH_ERR_PARSE},
        {"\r\n\r\nv 0 nan 0\n", "line 3: v: 'nan' is not a number", 0, CLOTH_ERR_PARSE},
        {"v 0 -inf 0\n", "line 1: v: '-inf' is not", 0, CLOTH_ERR_PARSE},
        {"v 0 1e999 0\n", "line 1: v: '1e999' is too large", 0, CLOTH_ERR_PARSE},
        {"v 0 0 \\\n y\n", "line 2: v: 'y'", 0, CLOTH_ERR_PARSE},
        {"v 0 \x01\xff 0\n", "line 1: v: '\?\?'", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2\n", "line 5: f has 2 corners but needs 3", 0, CLOTH_ERR_PARSE},
        {V4 "f\n", "line 5: f has 0 corners", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 0\n", "line 5: '0': no such vertex; 4 of 4", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 5\n", "line 5: '5': no such vertex", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 -5\n", "line 5: '-5': no such vertex", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 99999999999999999999999\n", "line 5: '9999", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 4294967297\n", "line 5: '4294967297': no such", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 x\n", "line 5: 'x' is not a face corner", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 3.5\n", "line 5: '3.5' is not a face corner", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 /3\n", "line 5: '/3' is not a face corner", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 3/\\\n1\n", "line 6: '1/", 0, CLOTH_OK},
        {V4 "f 1 2 1/1/1/1\n", "line 5: '1/1/1/1'", 0, CLOTH_ERR_PARSE},
        {V4 "f 1 2 -\n", "line 5: '-' is not", 0, CLOTH_ERR_PARSE},
        {V4 "f 1/1 2/1 3/1\n", "line 5: '1/1': no such vt; 0 of 0", 0, CLOTH_ERR_PARSE},
        {V4 "vt 0 0\nf 1/1 2/2 3/1\n", "line 6: '2/2': no such vt", 0, CLOTH_ERR_PARSE},
        {V4 "vt 0 0\nf 1/1 2/0 3/1\n", "line 6: '2/0': no such vt", 0, CLOTH_ERR_PARSE},
        {V4 "vt 0 0\nf 1/1 2/-2 3/1\n", "line 6: '2/-2': no such vt", 0, CLOTH_ERR_PARSE},
        {V4 "vt\nf 1 2 3\n", "line 5: vt has 0 numbers but needs 1", 0, CLOTH_ERR_PARSE},
        {V4 "vt nan 0\nf 1 2 3\n", "line 5: vt: 'nan'", 0, CLOTH_ERR_PARSE},
        {V4 "vt 0 0\nf 1/1 2/1 3\n", "line 6: '3' has no vt", 1, CLOTH_ERR_PARSE},
        {V4 "f 1 2 3\n", "line 5: '1' has no vt", 1, CLOTH_ERR_PARSE},
        {V4 "vt 1e300 0\nf 1/1 2/1 3/1\n", "line 5: vt times", 2, CLOTH_ERR_PARSE},
        {V4 "v 1e300 0 0\n", "line 5: v times scale 1e10 is too large", 3, CLOTH_ERR_PARSE},
        {"OFF\n3 1 0\n0 0 0\n", "no vertex", 0, CLOTH_ERR_PARSE},
    };
    size_t i;
    for (i = 0; i < sizeof bad / sizeof *bad; i++) {
        host              h;
        cloth_hooks       hooks = host_hooks(&h);
        cloth_obj_options opt = cloth_obj_options_default();
        cloth_mesh       *m = (cloth_mesh *)&h;
        opt.pattern_scale = bad[i].pattern == 2 ? 1e300 : bad[i].pattern == 1;
        if (bad[i].pattern == 3) opt.scale = 1e10;
        CHECK(cloth_obj_parse(&hooks, bad[i].text, strlen(bad[i].text), &opt, &m) ==
              bad[i].status);
        if (bad[i].status == CLOTH_OK) {
            cloth_mesh_destroy(&hooks, m);
            CHECK(h.live == 0);
            continue;
        }
        CHECK(m == NULL && h.live == 0 && h.errors == 1);
        if (!CHECK(strstr(h.text, bad[i].sentence) != NULL))
            printf("got: %s\nwant: %s\n", h.text, bad[i].sentence);
    }
}

static void obj_bad_arguments(void) {
    host              h;
    cloth_hooks       hooks = host_hooks(&h);
    cloth_obj_options opt = cloth_obj_options_default();
    FILE             *full;
    int               part = 5;
    cloth_mesh       *m = (cloth_mesh *)&h, mesh;
    static const char text[] = V4 "f 1 2 3\n";
    size_t            n = sizeof text - 1;
    CHECK(cloth_obj_parse(&hooks, NULL, 0, NULL, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_obj_parse(&hooks, text, n, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    opt.cookie = 0;
    CHECK(cloth_obj_parse(&hooks, text, n, &opt, &m) == CLOTH_ERR_UNINIT && !m);
    opt = cloth_obj_options_default();
    opt.scale = 0;
    CHECK(cloth_obj_parse(&hooks, text, n, &opt, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "options.scale = 0") != NULL);
    opt = cloth_obj_options_default();
    opt.pattern_scale = HOST_NAN;
    CHECK(cloth_obj_parse(&hooks, text, n, &opt, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "options.pattern_scale = NaN") != NULL);
    opt = cloth_obj_options_default();
    opt.parts = (cloth_obj_parts)9;
    CHECK(cloth_obj_parse(&hooks, text, n, &opt, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(strstr(h.text, "options.parts = 9") != NULL);
    CHECK(cloth_obj_load(&hooks, NULL, NULL, &m) == CLOTH_ERR_ARGUMENT && !m);
    CHECK(cloth_obj_load(&hooks, "/", NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_obj_load(&hooks, "no/such/file.obj", NULL, &m) == CLOTH_ERR_IO && !m);
    CHECK(strstr(h.text, "no/such/file.obj") != NULL);
    CHECK(cloth_obj_load(&hooks, ".", NULL, &m) == CLOTH_ERR_IO && !m);
    CHECK(cloth_obj_format(&hooks, NULL, NULL, 0, &n) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_obj_save(&hooks, NULL, NULL) == CLOTH_ERR_ARGUMENT);
    CHECK(cloth_obj_save(&hooks, "x.obj", NULL) == CLOTH_ERR_ARGUMENT);
    memset(&mesh, 0, sizeof mesh);
    mesh.nv = 3;
    CHECK(cloth_obj_format(&hooks, &mesh, NULL, 0, &n) == CLOTH_ERR_ARGUMENT);
    m = parse(text, NULL);
    if (m) {
        CHECK(cloth_obj_save(&hooks, "no/such/dir.obj", m) == CLOTH_ERR_IO);
        full = fopen("/dev/full", "wb");    /* where there is one: nothing can be written to it */
        if (full) {
            fclose(full);
            CHECK(cloth_obj_save(&hooks, "/dev/full", m) == CLOTH_ERR_IO);
            CHECK(strstr(h.text, "cannot be written") != NULL);
        }
        m->x[3] = HOST_NAN;
        CHECK(cloth_obj_format(&hooks, m, NULL, 0, &n) == CLOTH_ERR_NONFINITE);
        m->x[3] = 0;
        m->faces[1] = 4;
        CHECK(cloth_obj_format(&hooks, m, NULL, 0, &n) == CLOTH_ERR_ARGUMENT);
        CHECK(strstr(h.text, "faces[0] corner 1 = 4") != NULL);
        m->faces[1] = 1;
        mesh = *m;
        mesh.npart = 1;
        mesh.part = &part;
        CHECK(cloth_obj_format(&hooks, &mesh, NULL, 0, &n) == CLOTH_ERR_ARGUMENT);
        CHECK(strstr(h.text, "part[0] = 5") != NULL);
        mesh = *m;
        mesh.nr = -1;
        CHECK(cloth_obj_format(&hooks, &mesh, NULL, 0, &n) == CLOTH_ERR_ARGUMENT);
        mesh.nr = 2;
        mesh.vt = m->x;
        mesh.render_faces = m->faces;
        CHECK(cloth_obj_format(&hooks, &mesh, NULL, 0, &n) == CLOTH_ERR_ARGUMENT);
        CHECK(strstr(h.text, "render_faces[0] corner 2 = 2") != NULL);
    }
    cloth_mesh_destroy(NULL, m);
    CHECK(h.live == 0);
}

/* --- round trips --- */

static char *format(const cloth_mesh *m, size_t *n) {
    char  *text;
    size_t again = 0;
    CHECK(cloth_obj_format(NULL, m, NULL, 0, n) == CLOTH_OK);
    text = (char *)malloc(*n + 1);
    CHECK(cloth_obj_format(NULL, m, text, *n, &again) == CLOTH_OK && again == *n);
    text[*n] = '\0';
    return text;
}

static int same_mesh(const cloth_mesh *a, const cloth_mesh *b) {
    const size_t v = (size_t)a->nv, f = (size_t)a->nf, r = (size_t)a->nr;
    if (a->nv != b->nv || a->nf != b->nf || a->nr != b->nr || a->npart != b->npart ||
        !a->X != !b->X || !a->part != !b->part)
        return 0;
    return memcmp(a->x, b->x, 24 * v) == 0 && memcmp(a->faces, b->faces, 12 * f) == 0 &&
           (!a->X || memcmp(a->X, b->X, 48 * f) == 0) &&
           (!a->part || memcmp(a->part, b->part, 4 * f) == 0) &&
           (!r || (memcmp(a->vt, b->vt, 16 * r) == 0 &&
                   memcmp(a->render_vertex, b->render_vertex, 4 * r) == 0 &&
                   memcmp(a->render_faces, b->render_faces, 12 * f) == 0));
}

static void obj_round_trip_random_bits(void) {
    cloth_mesh *m = NULL, *back = NULL;
    char       *text;
    size_t      n;
    int         i;
    CHECK(cloth_mesh_sheet(NULL, CLOTH_SHEET_DIAGONAL, 60, 60, 1.0, 1.0, &m) == CLOTH_OK);
    if (!m) return;
    m->X = NULL;
    for (i = 0; i < 3 * m->nv; i++)
        do m->x[i] = from_bits(random_bits());
        while (!clothi_finite(m->x[i]));
    text = format(m, &n);
    CHECK(cloth_obj_parse(NULL, text, n, NULL, &back) == CLOTH_OK);
    if (back) CHECK(same_mesh(m, back));
    cloth_mesh_destroy(NULL, back);
    cloth_mesh_destroy(NULL, m);
    free(text);
}

/* the pattern of a tube with its seam, parts, and render corners survive */
static void obj_round_trip_seams(void) {
    cloth_obj_options opt = cloth_obj_options_default();
    cloth_mesh       *m[2] = {NULL, NULL}, *all = NULL, *back = NULL, *again = NULL;
    char             *text;
    size_t            n, capacity;
    opt.pattern_scale = 1;
    opt.parts = CLOTH_OBJ_PARTS_GROUPS;
    CHECK(cloth_mesh_tube(NULL, 0.2, 1.0, 7, 5, &m[0]) == CLOTH_OK);
    CHECK(cloth_mesh_disc(NULL, 0.2, 3, &m[1]) == CLOTH_OK);
    CHECK(cloth_mesh_merge(NULL, m, 2, &all) == CLOTH_OK);
    cloth_mesh_destroy(NULL, m[0]);
    cloth_mesh_destroy(NULL, m[1]);
    if (!all) return;
    text = format(all, &n);
    CHECK(cloth_obj_parse(NULL, text, n, &opt, &back) == CLOTH_OK);
    if (back) {
        /* one vt per vertex, and up to three more where faces change sides of the seam */
        CHECK(back->nr >= all->nv + 5 && back->nr <= all->nv + 3 * 5);
        CHECK(memcmp(back->X, all->X, 48 * (size_t)all->nf) == 0);
        back->nr = 0;
        CHECK(same_mesh(all, back));
    }
    cloth_mesh_destroy(NULL, back);
    CHECK(cloth_obj_parse(NULL, text, n, &opt, &back) == CLOTH_OK);
    free(text);
    if (back) {
        text = format(back, &n);                        /* now with render corners */
        CHECK(cloth_obj_parse(NULL, text, n, &opt, &again) == CLOTH_OK);
        if (again) CHECK(same_mesh(back, again));
        cloth_mesh_destroy(NULL, again);
        for (capacity = 0; capacity < n; capacity += 97) {
            char   part[4096];
            size_t needed = 0;
            memset(part, '@', sizeof part);
            if (capacity >= sizeof part) break;
            CHECK(cloth_obj_format(NULL, back, part, capacity, &needed) == CLOTH_ERR_CAPACITY);
            CHECK(needed == n && memcmp(part, text, capacity) == 0 && part[capacity] == '@');
        }
        free(text);
    }
    cloth_mesh_destroy(NULL, back);
    cloth_mesh_destroy(NULL, all);
}

static void obj_save_and_load(void) {
    static const char path[] = "test_obj.tmp.obj";
    host              h;
    cloth_hooks       hooks = host_hooks(&h);
    cloth_mesh       *m = NULL, *back = NULL;
    CHECK(cloth_mesh_disc(&hooks, 0.3, 30, &m) == CLOTH_OK);
    if (!m) return;
    m->X = NULL;
    CHECK(cloth_obj_save(&hooks, path, m) == CLOTH_OK);
    CHECK(cloth_obj_load(&hooks, path, NULL, &back) == CLOTH_OK);
    if (back) CHECK(same_mesh(m, back));
    cloth_mesh_destroy(&hooks, back);
    cloth_mesh_destroy(&hooks, m);
    CHECK(h.live == 0 && h.errors == 0);
    remove(path);
}

static const char small_obj[] =
    "# small\r\no first\nv 0 0 0\nv 1.25 0 -3e-1\nv 1 1 0 1.0\nv 0 1 0.1234567890123456789\n"
    "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\ng a\nf 1/1/1 2/2/1 \\\n 3/3/1\ng b\nf -4/-3//bad\n";

static void obj_truncated(void) {
    cloth_obj_options opt = cloth_obj_options_default();
    size_t            n, ok = 0;
    opt.parts = CLOTH_OBJ_PARTS_GROUPS;
    for (n = 0; n <= sizeof small_obj - 1; n++) {
        host         h;
        cloth_hooks  hooks = host_hooks(&h);
        cloth_mesh  *m = NULL;
        char        *exact = (char *)malloc(n + 1);     /* so that a sanitizer sees the end */
        cloth_status status;
        char        *copy = (char *)realloc(exact, n ? n : 1);
        memcpy(copy, small_obj, n);
        status = cloth_obj_parse(&hooks, copy, n, &opt, &m);
        CHECK((status == CLOTH_OK) == (m != NULL));
        CHECK(status == CLOTH_OK || (status == CLOTH_ERR_PARSE && h.errors == 1));
        ok += status == CLOTH_OK;
        cloth_mesh_destroy(&hooks, m);
        CHECK(h.live == 0);
        free(copy);
    }
    CHECK(ok > 5);                              /* between the first face and the second */
}

static void obj_failing_allocator(void) {
    cloth_obj_options opt = cloth_obj_options_default();
    static const char text[] = V4 "vt 0 0\nvt 1 1\ng a\nf 1/1 2/2 3/1 4/1\n";
    int               fail, call;
    opt.parts = CLOTH_OBJ_PARTS_GROUPS;
    opt.pattern_scale = 1;
    for (call = 0; call < 3; call++)
        for (fail = 1;; fail++) {
            host         h;
            cloth_hooks  hooks = host_hooks(&h);
            cloth_mesh  *m = NULL, *one = call == 1 ? parse(text, &opt) : NULL;
            cloth_status status;
            h.fail_at = fail;
            if (one) one->nr = 0;
            if (call == 0) status = cloth_obj_parse(&hooks, text, sizeof text - 1, &opt, &m);
            else if (call == 1) status = cloth_obj_save(&hooks, "test_obj.tmp.obj", one);
            else status = cloth_obj_load(&hooks, "test_obj.tmp.obj", &opt, &m);
            CHECK((status == CLOTH_OK && (call == 1 || m)) || (status == CLOTH_ERR_MEMORY && !m));
            if (status != CLOTH_OK) CHECK(h.live == 0 && h.errors == 1);
            cloth_mesh_destroy(&hooks, m);
            cloth_mesh_destroy(NULL, one);
            CHECK(h.live == 0);
            if (status == CLOTH_OK) break;
        }
    CHECK(fail > 3);
    remove("test_obj.tmp.obj");
}

/* a locale whose decimal point is a comma changes nothing */
static void obj_locale(void) {
    static const char *const names[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "de_DE"};
    size_t                   i;
    double                   a = 0;
    char                     text[64];
    for (i = 0; i < sizeof names / sizeof *names; i++)
        if (setlocale(LC_ALL, names[i])) break;
    CHECK(clothi_parse_double("0.5", 3, &a) && a == 0.5);
    CHECK(!clothi_parse_double("0,5", 3, &a));
    write_number(2.25, text);
    CHECK(strcmp(text, "2.25") == 0);
    setlocale(LC_ALL, "C");
    if (i == sizeof names / sizeof *names) SKIP("no locale with a decimal comma is installed");
}

/* every file of nasty/ ends in a status: the reader's, the check's and the topology's */
static void obj_nasty_files(void) {
    static const struct {
        const char  *name;
        cloth_status read, check;
        int          fault;         /* a kind that must be counted, -1: none */
    } files[] = {
        {"busted", CLOTH_OK, CLOTH_OK, -1},
        {"fan3", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_THREE_FACES},
        {"hourglass_ico", CLOTH_OK, CLOTH_OK, CLOTH_MESH_BOW_TIE},
        {"moebius", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_ORIENTATION},
        {"negative_indices", CLOTH_OK, CLOTH_OK, -1},
        {"skirt_f_duplicate_faces", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_DUPLICATE},
        {"skirt_f_far_from_origin_1e5", CLOTH_OK, CLOTH_OK, -1},
        {"skirt_f_flipped_faces", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_ORIENTATION},
        {"skirt_f_isolated_vertices", CLOTH_OK, CLOTH_OK, CLOTH_MESH_ISOLATED},
        {"skirt_f_near_coincident", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_ZERO_AREA},
        {"skirt_f_nonmanifold_fins", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_THREE_FACES},
        {"skirt_f_repeated_index", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_REPEATED},
        {"skirt_f_shuffled_soup_holes", CLOTH_OK, CLOTH_OK, CLOTH_MESH_BOW_TIE},
        {"skirt_f_tiny_scale_1e-4", CLOTH_OK, CLOTH_OK, -1},
        {"skirt_f_unwelded", CLOTH_OK, CLOTH_OK, -1},
        {"skirt_f_zero_area", CLOTH_OK, CLOTH_ERR_MESH, CLOTH_MESH_ZERO_AREA},
        {"soup", CLOTH_OK, CLOTH_OK, -1},
        {"raw/negative_indices", CLOTH_OK, CLOTH_OK, -1},
        {"raw/notenoughindices", CLOTH_ERR_PARSE, CLOTH_OK, -1},
        {"raw/polygonfaces", CLOTH_OK, CLOTH_OK, -1},
        {"raw/wallhole", CLOTH_OK, CLOTH_ERR_MESH, -1},
        {"raw/whitespace.off", CLOTH_ERR_PARSE, CLOTH_OK, -1},
    };
    size_t i;
    int    seen = 0;
    for (i = 0; i < sizeof files / sizeof *files; i++) {
        host              h;
        cloth_hooks       hooks = host_hooks(&h);
        char              name[128];
        cloth_mesh       *m = NULL;
        cloth_topology   *t = NULL;
        cloth_mesh_report r;
        const char       *path;
        cloth_status      status;
        snprintf(name, sizeof name, "data/nasty/%s%s", files[i].name,
                 strchr(files[i].name, '.') ? "" : ".obj");
        path = test_shared(name);
        if (!*path) continue;
        seen++;
        if (!CHECK(cloth_obj_load(&hooks, path, NULL, &m) == files[i].read))
            printf("%s: %s\n", name, h.text);
        if (m) {
            status = cloth_mesh_check(&hooks, m->nv, m->x, m->nf, m->faces, NULL, &r);
            if (!CHECK(status == files[i].check)) printf("%s: %d: %s\n", name, status, h.text);
            if (files[i].fault >= 0 && !CHECK(r.count[files[i].fault] > 0)) printf("%s\n", name);
            status = cloth_topology_create(&hooks, m->nv, m->nf, m->faces, &t);
            CHECK((status == CLOTH_OK) == (t != NULL));
            cloth_topology_destroy(&hooks, t);
        }
        cloth_mesh_destroy(&hooks, m);
        CHECK(h.live == 0);
    }
    if (!seen) SKIP("the shared data are not here");
    printf("  %d files\n", seen);
}

static void obj_speed(void) {
    cloth_mesh *m = NULL, *back = NULL;
    char       *text;
    size_t      n;
    clock_t     start;
    double      write, read;
    CHECK(cloth_mesh_disc(NULL, 1.0, 100, &m) == CLOTH_OK);
    if (!m) return;
    m->X = NULL;
    start = clock();
    text = format(m, &n);
    write = (double)(clock() - start) / CLOCKS_PER_SEC / 2;
    start = clock();
    CHECK(cloth_obj_parse(NULL, text, n, NULL, &back) == CLOTH_OK);
    read = (double)(clock() - start) / CLOCKS_PER_SEC;
    printf("  %d vertices, %.1f MB: written in %.3f s, read in %.3f s\n", m->nv, (double)n / 1e6,
           write, read);
    cloth_mesh_destroy(NULL, back);
    cloth_mesh_destroy(NULL, m);
    free(text);
}

int main(int argc, char **argv) {
    TEST_BEGIN(argc, argv);
    RUN(number_hard_cases);
    RUN(number_subnormal_ties);
    RUN(number_midpoints);
    RUN(number_random_texts);
    RUN(number_long_texts);
    RUN(number_written);
    RUN(number_round_trip);
    RUN(obj_forms);
    RUN(obj_values);
    RUN(obj_indices);
    RUN(obj_seams);
    RUN(obj_parts);
    RUN(obj_part_names);
    RUN(obj_refusals);
    RUN(obj_bad_arguments);
    RUN(obj_round_trip_random_bits);
    RUN(obj_round_trip_seams);
    RUN(obj_save_and_load);
    RUN(obj_truncated);
    RUN(obj_failing_allocator);
    RUN(obj_locale);
    RUN(obj_nasty_files);
    RUN(obj_speed);
    return TEST_END();
}
