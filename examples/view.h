/* view.h - writes ONE self-contained HTML page that plays the motion of triangle meshes.
 * SPDX-License-Identifier: MIT
 *
 * Helper of the examples; plain arrays in, one file out; needs libc and libm alone.
 *
 *     view *v = view_open("Hanging sheet", "0.2 kg/m^2, two corners pinned");
 *     int sheet = view_mesh(v, "sheet", VIEW_CLOTH, nv, nf, faces);
 *     view_scalar(v, 0, "stretch", "m/m", VIEW_FACE, 0.9, 1.0, 1.1);
 *     for (...) {
 *         view_time(v, t);                        begins a frame, t rising
 *         view_stretch(nf, faces, x, X, stretch);
 *         view_put(v, sheet, x, stretch, NULL);   a mesh not put stays where it was
 *     }
 *     const char *error = view_close(v, "out/hang.html");
 *     if (error) fprintf(stderr, "out/hang.html: %s\n", error);
 *
 * The page opens from the file system with no network, in WebGL or, where there is none (or
 * with #2d in the address), on a 2D canvas. Drag turns, wheel or pinch zooms, right button or
 * two fingers pan; space plays, arrows step. #t=SECONDS shows that time, paused.
 * The light stands still and casts shadows (in 2D on the floor alone); a cloth's back has a colour
 * of its own, the right part of its chip below the picture.
 * document.title becomes 'ready N frames' after the first drawing, or 'error: ...'.
 *
 * Errors are kept until view_close returns them: no call in between has to be checked, and
 * every call accepts a NULL view. Texts are UTF-8 and copied; arrays are copied.
 *
 * What is stored. Positions are rounded to 16 bits of each mesh's box (23 um for 1.5 m), scalars
 * to 8 bits of the legend's range. Each row of a frame is predicted from the frames before it
 *
 *     predictor p   0: x[i-1]   1: x'   2: 2x' - x''   3, 4: as 1, 2 plus the error at i-1
 *
 * (x' and x'' are the same vertex one and two frames back), the one with the smallest sum of
 * |error| taken, and the errors are written as Rice codes: blocks of 32 share k, an error e is
 * u = 2e or -2e-1, stored as u >> k ones, a zero and the low k bits. The bytes are in base64
 * with two letters replaced.
 * A page never exceeds VIEW_MAX_BYTES: if need be positions get fewer bits, then every second,
 * third, ... frame is left out, and the page says so.
 *
 * Limits: a per-face scalar is drawn as the mean of the faces at a vertex (the range under the
 * legend is that of the faces). Memory: 4 bytes per coordinate and frame until view_close.
 */
#ifndef CLOTHSIM_EXAMPLE_VIEW_H
#define CLOTHSIM_EXAMPLE_VIEW_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VIEW_MAX_BYTES  4000000     /* of a page                                        */
#define VIEW_MAX_MESHES 32
#define VIEW_MAX_INDEX  4000000     /* vertices or faces of one mesh: the codes' 24 bits */

typedef enum view_kind { VIEW_CLOTH = 0, VIEW_OBSTACLE = 1 } view_kind;
typedef enum view_where { VIEW_VERTEX = 0, VIEW_FACE = 1 } view_where;

typedef struct view_rows {          /* what a mesh showed at each put                   */
    float *data;                    /* [count x width]                                  */
    size_t width;
    int    count, cap;
} view_rows;

typedef struct view_body {
    char     *name;
    view_kind kind;
    int       nv, nf;
    int      *faces;                /* [nf x 3]                                         */
    view_rows x;                    /* width 3 nv, m                                    */
    view_rows s[2];                 /* width nv or nf                                   */
    int      *put;                  /* [frames] the put that a frame shows              */
    int       last;                 /* 1 + the frame of the last put, 0: none           */
    double    lo[3], hi[3];         /* box over all frames, m                           */
} view_body;

typedef struct view_legend {
    char      *name, *unit;         /* name NULL: not used                              */
    view_where where;
    double     lo, mid, hi;
    double     least, most;         /* of the data                                      */
} view_legend;

typedef struct view {
    char       *title, *caption;
    int         up;                 /* 1: y, 2: z                                       */
    double      azimuth, elevation; /* degrees                                          */
    double      floor;              /* m; NAN: automatic                                */
    int         nmesh, frames, cap;
    view_body   mesh[VIEW_MAX_MESHES];
    view_legend legend[2];
    double     *t;                  /* [frames] s                                       */
    long        held;               /* coordinates that were not finite                 */
    const char *error;              /* the first one, a literal                         */
} view;

typedef struct view_buffer {        /* grows to its limit, then full is set             */
    char    *p;
    size_t   n, cap, limit;
    unsigned acc;                   /* bits not yet written, the low `bits` of it       */
    int      bits, full, failed;
    unsigned group;                 /* bytes waiting for base64                         */
    int      waiting;
} view_buffer;

/* ===== the page: everything before and after the data ==================================== */

static const char *const view_page_head[] = {
    "<!DOCTYPE html>\n",
    "<html lang='en'><head><meta charset='utf-8'>\n",
    "<meta name='viewport' content='width=device-width, initial-scale=1'>\n",
    "<title>loading</title>\n",
    "<style>\n",
    ":root { color-scheme: light dark; --bg: #f6f5f2; --panel: #ffffff; --ink: #1d2126;\n",
    "  --soft: #626a73; --line: #d9d7d1; --accent: #1f5fa8; }\n",
    "@media (prefers-color-scheme: dark) {\n",
    "  :root { --bg: #15181c; --panel: #1e2227; --ink: #e9eaec; --soft: #9ba3ad;\n",
    "    --line: #363c44; --accent: #7db4f0; } }\n",
    "* { box-sizing: border-box; }\n",
    "html, body { height: 100%; margin: 0; }\n",
    "body { display: flex; flex-direction: column; background: var(--bg); color: var(--ink);\n",
    "  font: 15px/1.4 system-ui, -apple-system, 'Segoe UI', Roboto, 'Liberation Sans', "
    "sans-serif; }\n",
    "header { padding: 12px 18px 6px; }\n",
    "h1 { font-size: 19px; font-weight: 650; margin: 0; }\n",
    "header p { margin: 2px 0 0; color: var(--soft); max-width: 110ch; }\n",
    "main { position: relative; flex: 1 1 auto; min-height: 180px; overflow: hidden; }\n",
    "canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; }\n",
    "#gl { touch-action: none; cursor: grab; }\n",
    "#gl:active { cursor: grabbing; }\n",
    "#ink { pointer-events: none; }\n",
    "#gl:focus-visible { outline: 2px solid var(--accent); outline-offset: -2px; }\n",
    "footer { background: var(--panel); border-top: 1px solid var(--line); padding: 8px 18px "
    "10px; }\n",
    ".row { display: flex; flex-wrap: wrap; align-items: center; gap: 6px 11px; }\n",
    ".keys { display: flex; gap: 4px; }\n",
    "button, select { font: inherit; color: inherit; background: var(--bg);\n",
    "  border: 1px solid var(--line); border-radius: 7px; height: 34px; padding: 0 6px; }\n",
    "button { min-width: 36px; padding: 0 8px; cursor: pointer; }\n",
    "button svg { width: 16px; height: 16px; fill: currentColor; vertical-align: -3px; }\n",
    "button:hover, select:hover { border-color: var(--accent); }\n",
    ":focus-visible { outline: 2px solid var(--accent); outline-offset: 1px; }\n",
    "#scrub { flex: 1 1 180px; min-width: 120px; accent-color: var(--accent); }\n",
    "#clock { font-variant-numeric: tabular-nums; min-width: 14em; font-size: 14px; }\n",
    "label { color: var(--soft); display: inline-flex; align-items: center; gap: 6px; }\n",
    "label select { color: var(--ink); }\n",
    "#legend { margin-top: 8px; gap: 4px 16px; color: var(--soft); font-size: 13px; }\n",
    "#legend b { color: var(--ink); font-weight: 600; }\n",
    "#scale { position: relative; flex: 0 1 340px; min-width: 220px; height: 32px; }\n",
    "#ramp { height: 11px; border-radius: 3px; border: 1px solid var(--line); }\n",
    "#scale span { position: absolute; top: 14px; transform: translateX(-50%);\n",
    "  font-variant-numeric: tabular-nums; white-space: nowrap; }\n",
    "#scale span:first-of-type { transform: none; }\n",
    "#scale span:last-of-type { transform: translateX(-100%); }\n",
    "#note { margin: 6px 0 0; font-size: 12.5px; color: var(--soft); }\n",
    "#note:empty, #caption:empty, #legend[hidden] { display: none; }\n",
    ".chip { display: inline-block; width: 11px; height: 11px; border-radius: 3px;\n",
    "  margin-right: 4px; vertical-align: -1px; }\n",
    "@media (max-width: 560px) { header, footer { padding-left: 12px; padding-right: 12px; }\n",
    "  #clock { min-width: 0; } .wide { display: none; } }\n",
    "</style></head><body>\n",
    "<header><h1 id='head'></h1><p id='caption'></p></header>\n",
    "<main id='stage'><canvas id='gl' tabindex='0' role='img'></canvas>\n",
    "<canvas id='ink' aria-hidden='true'></canvas></main>\n",
    "<footer>\n",
    "<div class='row'>\n",
    "<div class='keys' role='group' aria-label='Playback'>\n",
    "<button id='back' title='One frame back (left arrow)' aria-label='One frame back'>\n",
    "<svg viewBox='0 0 24 24'><path d='M5 4h3v16H5zM20 4v16L9 12z'/></svg></button>\n",
    "<button id='play' title='Play or pause (space)' aria-label='Play'>\n",
    "<svg viewBox='0 0 24 24'><path id='icon' d='M6 4v16l14-8z'/></svg></button>\n",
    "<button id='next' title='One frame on (right arrow)' aria-label='One frame on'>\n",
    "<svg viewBox='0 0 24 24'><path d='M16 4h3v16h-3zM4 4v16l11-8z'/></svg></button>\n",
    "</div>\n",
    "<input id='scrub' type='range' min='0' step='1' value='0' aria-label='Frame'>\n",
    "<span id='clock' role='status' aria-live='off'></span>\n",
    "<label>Speed <select id='speed'><option value='0.1'>0.1&times;</option>\n",
    "<option value='0.25'>0.25&times;</option><option value='0.5'>0.5&times;</option>\n",
    "<option value='1' selected>1&times;</option><option value='2'>2&times;</option>\n",
    "<option value='4'>4&times;</option></select></label>\n",
    "<label id='colourbox'>Colour <select id='colour'></select></label>\n",
    "<label><input id='wire' type='checkbox'> Mesh</label>\n",
    "<button id='home' title='Reset the view (R)'>Reset</button>\n",
    "</div>\n",
    "<div class='row' id='legend'><b id='what'></b>\n",
    "<div id='scale'><div id='ramp'></div></div><span id='now'></span></div>\n",
    "<div class='row' id='names' style='margin-top:6px;font-size:13px;color:var(--soft)'></div>\n",
    "<p id='note'></p>\n",
    "</footer>\n",
    "<script>\n",
    "'use strict';\n",
    "function $(id) { return document.getElementById(id); }\n",
    "function fail(e) {\n",
    "  document.title = 'error: ' + (e && e.message || e);\n",
    "  $('note').textContent = 'This page could not be drawn: ' + (e && e.message || e);\n",
    "}\n",
    "window.onerror = function (m) { fail(m); };\n",
    NULL
};

static const char *const view_page_code[] = {
    "/* ---- decoding: bits, most significant first; rows of Rice codes in blocks of 32 ---- */\n",
    "function Bits(text) {\n",
    "  const s = atob(text.replace(/-/g, 'h').replace(/[.]/g, 'H')), n = s.length;\n",
    "  const u = new Uint8Array(n + 8);\n",
    "  for (let i = 0; i < n; i++) u[i] = s.charCodeAt(i);\n",
    "  this.u = u;\n",
    "  this.p = 0;\n",
    "}\n",
    "Bits.prototype.peek = function () {\n",
    "  const i = this.p >> 3, u = this.u;\n",
    "  return ((u[i] << 24) | (u[i + 1] << 16) | (u[i + 2] << 8) | u[i + 3]) << (this.p & 7);\n",
    "};\n",
    "Bits.prototype.get = function (n) {\n",
    "  if (n === 0) return 0;\n",
    "  const w = this.peek() >>> (32 - n);\n",
    "  this.p += n;\n",
    "  return w;\n",
    "};\n",
    "Bits.prototype.row = function (out, n) {\n",
    "  let k = 0;\n",
    "  for (let i = 0; i < n; i++) {\n",
    "    if (i % 32 === 0) k = this.get(4);\n",
    "    const q = Math.clz32(~this.peek());\n",
    "    let u;\n",
    "    if (q < 20) { this.p += q + 1; u = q << k | this.get(k); }\n",
    "    else { this.p += 20; u = this.get(24); }\n",
    "    out[i] = (u >>> 1) ^ -(u & 1);\n",
    "  }\n",
    "};\n",
    "/* one channel: predicted from the value before it (0), from the frame before (1), by  */\n",
    "/* the straight line through two frames (2), or 1 and 2 with the error's change (3, 4) */\n",
    "function channel(bits, r, n, x, a, b, o) {\n",
    "  const mode = bits.get(3), run = mode === 0 || mode > 2;\n",
    "  const ca = mode === 0 ? 0 : (mode === 2 || mode === 4) ? 2 : 1, cb = ca === 2 ? 1 : 0;\n",
    "  let d = 0;\n",
    "  bits.row(r, n);\n",
    "  for (let i = 0; i < n; i++) {\n",
    "    d = run ? d + r[i] : r[i];\n",
    "    x[o + i] = d + ca * a[o + i] - cb * b[o + i];\n",
    "  }\n",
    "}\n",
    "function frames(text, count, n, parts, Type) {\n",
    "  const bits = new Bits(text), r = new Int32Array(n), out = [];\n",
    "  for (let f = 0; f < count; f++) {\n",
    "    const x = new Type(n * parts), a = f ? out[f - 1] : x, b = f > 1 ? out[f - 2] : a;\n",
    "    for (let c = 0; c < parts; c++) channel(bits, r, n, x, a, b, c * n);\n",
    "    out.push(x);\n",
    "  }\n",
    "  return out;\n",
    "}\n",
    "function decode(m) {\n",
    "  const d = new Int32Array(3 * m.nf);\n",
    "  let a = 0;\n",
    "  new Bits(m.faces).row(d, 3 * m.nf);\n",
    "  m.tri = new Uint32Array(3 * m.nf);\n",
    "  for (let i = 0; i < 3 * m.nf; i++) m.tri[i] = a += d[i];\n",
    "  m.q = frames(m.x, m.frames, m.nv, 3, Uint16Array);\n",
    "  m.sq = m.s.map(function (s) {\n",
    "    return s && frames(s.data, s.frames, s.face ? m.nf : m.nv, 1, Uint8Array);\n",
    "  });\n",
    "  m.pos = new Float32Array(3 * m.nv);\n",
    "  m.nrm = new Float32Array(3 * m.nv);\n",
    "  m.val = new Float32Array(m.nv);\n",
    "  m.rgb = new Uint8Array(4 * m.nv);\n",
    "  edges(m);\n",
    "}\n",
    "function edges(m) {\n",
    "  const seen = new Map(), t = m.tri, all = [], rim = [];\n",
    "  m.share = new Float32Array(m.nv);\n",
    "  for (let i = 0; i < t.length; i++) {\n",
    "    const a = t[i], b = t[i % 3 === 2 ? i - 2 : i + 1], k = Math.min(a, b) * m.nv + "
    "Math.max(a, b);\n",
    "    m.share[a]++;\n",
    "    seen.set(k, (seen.get(k) || 0) + 1);\n",
    "  }\n",
    "  seen.forEach(function (c, k) {\n",
    "    const a = Math.floor(k / m.nv), b = k - a * m.nv;\n",
    "    all.push(a, b);\n",
    "    if (c === 1) rim.push(a, b);\n",
    "  });\n",
    "  m.wire = new Uint32Array(all);\n",
    "  m.rim = new Uint32Array(rim);\n",
    "}\n",
    "/* ---- one instant: positions and normals between two frames ---- */\n",
    "const N = D.times.length, T0 = N ? D.times[0] : 0, T1 = N ? D.times[N - 1] : 0;\n",
    "function locate(t) {\n",
    "  let a = 0, b = N - 1;\n",
    "  while (b - a > 1) { const c = (a + b) >> 1; if (D.times[c] <= t) a = c; else b = c; }\n",
    "  if (N < 2) return [0, 0, 0];\n",
    "  const w = (t - D.times[a]) / (D.times[b] - D.times[a]);\n",
    "  return [a, b, Math.min(1, Math.max(0, w))];\n",
    "}\n",
    "function pick(list, f) { return list[Math.min(f, list.length - 1)]; }\n",
    "function place(m, at) {\n",
    "  const a = pick(m.q, at[0]), b = pick(m.q, at[1]), w = at[2], n = m.nv, p = m.pos;\n",
    "  const zup = D.up === 2;\n",
    "  for (let i = 0; i < n; i++) {\n",
    "    const x = m.lo[0] + m.step[0] * (a[i] + w * (b[i] - a[i]));\n",
    "    const y = m.lo[1] + m.step[1] * (a[n + i] + w * (b[n + i] - a[n + i]));\n",
    "    const z = m.lo[2] + m.step[2] * (a[2 * n + i] + w * (b[2 * n + i] - a[2 * n + i]));\n",
    "    p[3 * i] = x; p[3 * i + 1] = zup ? z : y; p[3 * i + 2] = zup ? -y : z;\n",
    "  }\n",
    "  normals(m.tri, p, m.nrm);\n",
    "}\n",
    "function normals(t, p, n) {\n",
    "  n.fill(0);\n",
    "  for (let f = 0; f < t.length; f += 3) {\n",
    "    const a = 3 * t[f], b = 3 * t[f + 1], c = 3 * t[f + 2];\n",
    "    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];\n",
    "    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];\n",
    "    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;\n",
    "    n[a] += x; n[a + 1] += y; n[a + 2] += z;\n",
    "    n[b] += x; n[b + 1] += y; n[b + 2] += z;\n",
    "    n[c] += x; n[c + 1] += y; n[c + 2] += z;\n",
    "  }\n",
    "  for (let i = 0; i < n.length; i += 3) {\n",
    "    const l = Math.hypot(n[i], n[i + 1], n[i + 2]) || 1;\n",
    "    n[i] /= l; n[i + 1] /= l; n[i + 2] /= l;\n",
    "  }\n",
    "}\n",
    "/* ---- colour ---- */\n",
    "const dark = matchMedia('(prefers-color-scheme: dark)');\n",
    "const CLOTH = [[226, 209, 180, 94, 130, 160], [126, 170, 190, 190, 140, 100],\n",
    "  [196, 156, 170, 116, 140, 122], [160, 184, 140, 150, 124, 164]];\n",
    "const COLD = [[33, 86, 172], [90, 150, 214], [176, 205, 232], [236, 233, 226]];\n",
    "const HOT = [[236, 233, 226], [246, 196, 140], [230, 126, 52], [166, 42, 16]];\n",
    "const ONE = [[240, 230, 212], [208, 176, 216], [148, 94, 182], [78, 28, 110]];\n",
    "function along(list, t) {\n",
    "  const u = Math.min(1, Math.max(0, t)) * (list.length - 1), i = Math.min(list.length - "
    "2, u | 0);\n",
    "  return [0, 1, 2].map(function (c) { return list[i][c] + (u - i) * (list[i + 1][c] - "
    "list[i][c]); });\n",
    "}\n",
    "function shade(s, u) {\n",
    "  const c = s.two ? (s.mid - s.lo) / (s.hi - s.lo) : -1;\n",
    "  if (!s.two) return along(ONE, u);\n",
    "  return u < c ? along(COLD, u / c) : along(HOT, (u - c) / (1 - c));\n",
    "}\n",
    "function table(s) {\n",
    "  s.rgb = new Uint8Array(768);\n",
    "  for (let i = 0; i < 256; i++) s.rgb.set(shade(s, i / 255), 3 * i);\n",
    "}\n",
    "function paint(m, at, mode) {\n",
    "  const c = m.rgb, n = m.nv, list = mode >= 0 ? m.sq[mode] : null, base = plain(m);\n",
    "  if (!list) {\n",
    "    for (let i = 0; i < n; i++) { c[4 * i] = base[0]; c[4 * i + 1] = base[1]; c[4 * i + "
    "2] = base[2]; }\n",
    "    return;\n",
    "  }\n",
    "  const a = pick(list, at[0]), b = pick(list, at[1]), w = at[2], v = m.val, t = m.tri;\n",
    "  const rgb = D.scalars[mode].rgb;\n",
    "  if (m.s[mode].face) {\n",
    "    v.fill(0);\n",
    "    for (let i = 0; i < t.length; i++) {\n",
    "      const f = i / 3 | 0;\n",
    "      v[t[i]] += (a[f] + w * (b[f] - a[f])) / m.share[t[i]];\n",
    "    }\n",
    "  } else for (let i = 0; i < n; i++) v[i] = a[i] + w * (b[i] - a[i]);\n",
    "  for (let i = 0; i < n; i++) {\n",
    "    const k = 3 * Math.round(v[i]);\n",
    "    c[4 * i] = rgb[k]; c[4 * i + 1] = rgb[k + 1]; c[4 * i + 2] = rgb[k + 2];\n",
    "  }\n",
    "}\n",
    "function plain(m) {\n",
    "  if (m.cloth) return CLOTH[m.tone % CLOTH.length];\n",
    "  return dark.matches ? [112, 118, 126] : [150, 154, 160];\n",
    "}\n",
    "function rear(m) {\n",
    "  if (!m.cloth) return [70, 72, 76, 1];\n",
    "  if (mode >= 0 && m.sq[mode]) return [84, 104, 130, 0.22];\n",
    "  return plain(m).slice(3).concat(1);\n",
    "}\n",
    "/* ---- camera ---- */\n",
    "const cam = { az: 0, el: 0, far: 1, at: [0, 0, 0] }, FOV = 30 * Math.PI / 180;\n",
    "let box = null, floorY = 0, grid = null, wide = 1, high = 1;\n",
    "function basis() {\n",
    "  const ca = Math.cos(cam.az), sa = Math.sin(cam.az), ce = Math.cos(cam.el), se = "
    "Math.sin(cam.el);\n",
    "  const b = [sa * ce, se, ca * ce], r = [ca, 0, -sa], u = [-sa * se, ce, -ca * se];\n",
    "  const eye = cam.at.map(function (v, i) { return v + cam.far * b[i]; });\n",
    "  return { r: r, u: u, b: b, eye: eye };\n",
    "}\n",
    "function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }\n",
    "function matrix(B) {\n",
    "  const f = 1 / Math.tan(FOV / 2), near = cam.far * 0.02, far = cam.far * 8 + 2 * "
    "box.size;\n",
    "  const P = [f * high / wide, f, (far + near) / (near - far), 2 * far * near / (near - "
    "far)];\n",
    "  const m = new Float32Array(16), rows = [B.r, B.u, B.b];\n",
    "  for (let i = 0; i < 3; i++) {\n",
    "    m[4 * i] = P[0] * B.r[i]; m[4 * i + 1] = P[1] * B.u[i];\n",
    "    m[4 * i + 2] = P[2] * B.b[i]; m[4 * i + 3] = -B.b[i];\n",
    "  }\n",
    "  const e = rows.map(function (q) { return -dot(q, B.eye); });\n",
    "  m[12] = P[0] * e[0]; m[13] = P[1] * e[1]; m[14] = P[2] * e[2] + P[3]; m[15] = -e[2];\n",
    "  return m;\n",
    "}\n",
    "function screen(M, p) {\n",
    "  const w = M[3] * p[0] + M[7] * p[1] + M[11] * p[2] + M[15];\n",
    "  const x = M[0] * p[0] + M[4] * p[1] + M[8] * p[2] + M[12];\n",
    "  const y = M[1] * p[0] + M[5] * p[1] + M[9] * p[2] + M[13];\n",
    "  return [(x / w * 0.5 + 0.5) * wide, (0.5 - y / w * 0.5) * high, w];\n",
    "}\n",
    "function bounds() {\n",
    "  const all = [[1e30, 1e30, 1e30], [-1e30, -1e30, -1e30]];\n",
    "  function grow(m, limit) {\n",
    "    let lo = m.lo.slice(), hi = m.lo.map(function (v, i) { return v + m.step[i] * "
    "m.levels; });\n",
    "    if (D.up === 2) { const l = lo, h = hi; lo = [l[0], l[2], -h[1]]; hi = [h[0], h[2], "
    "-l[1]]; }\n",
    "    for (let i = 0; i < 3; i++) {\n",
    "      const s = limit ? 0.6 * (limit[1][i] - limit[0][i]) + 0.5 * limit[2] : 0;\n",
    "      all[0][i] = Math.min(all[0][i], limit ? Math.max(lo[i], limit[0][i] - s) : lo[i]);\n",
    "      all[1][i] = Math.max(all[1][i], limit ? Math.min(hi[i], limit[1][i] + s) : hi[i]);\n",
    "    }\n",
    "  }\n",
    "  const soft = D.meshes.filter(function (m) { return m.cloth; });\n",
    "  (soft.length ? soft : D.meshes).forEach(function (m) { grow(m, null); });\n",
    "  const c = all.map(function (v) { return v.slice(); });\n",
    "  c.push(Math.max(c[1][0] - c[0][0], c[1][1] - c[0][1], c[1][2] - c[0][2]));\n",
    "  if (soft.length) D.meshes.forEach(function (m) { if (!m.cloth) grow(m, c); });\n",
    "  const ext = [0, 1, 2].map(function (i) { return all[1][i] - all[0][i]; });\n",
    "  box = { lo: all[0], hi: all[1], size: Math.max(ext[0], ext[1], ext[2], 1e-6) };\n",
    "  floorY = D.floor !== null ? D.floor\n",
    "    : all[0][1] >= -1e-3 * box.size && all[0][1] < 0.5 * box.size ? 0 : all[0][1] - 0.03 "
    "* box.size;\n",
    "  ruler();\n",
    "}\n",
    "function ruler() {\n",
    "  const e = Math.max(box.hi[0] - box.lo[0], box.hi[2] - box.lo[2], 0.35 * box.size);\n",
    "  const p = Math.pow(10, Math.floor(Math.log10(e / 4))), k = e / 4 / p;\n",
    "  const big = p * (k > 5 ? 10 : k > 2 ? 5 : k > 1 ? 2 : 1), small = big / 5, lo = [], hi "
    "= [];\n",
    "  [0, 2].forEach(function (a) {\n",
    "    const pad = Math.max(0, 0.35 * box.size - (box.hi[a] - box.lo[a])) / 2 + 0.3 * small;\n",
    "    lo.push(Math.floor((box.lo[a] - pad) / small) * small);\n",
    "    hi.push(Math.ceil((box.hi[a] + pad) / small) * small);\n",
    "  });\n",
    "  const thin = [], bold = [];\n",
    "  for (let a = 0; a < 2; a++)\n",
    "    for (let i = Math.round(lo[a] / small); i <= Math.round(hi[a] / small); i++) {\n",
    "      const v = i * small, to = i % 5 === 0 ? bold : thin;\n",
    "      if (a === 0) to.push(v, floorY, lo[1], v, floorY, hi[1]);\n",
    "      else to.push(lo[0], floorY, v, hi[0], floorY, v);\n",
    "    }\n",
    "  grid = { big: big, lo: lo, hi: hi, thin: new Float32Array(thin), bold: new "
    "Float32Array(bold) };\n",
    "}\n",
    "function reset() {\n",
    "  cam.az = D.camera[0] * Math.PI / 180;\n",
    "  cam.el = D.camera[1] * Math.PI / 180;\n",
    "  cam.at = [0, 1, 2].map(function (i) { return (box.lo[i] + box.hi[i]) / 2; });\n",
    "  cam.at[1] = (Math.min(floorY, box.lo[1]) + box.hi[1]) / 2;\n",
    "  const pts = [];\n",
    "  for (let i = 0; i < 8; i++)\n",
    "    pts.push([i & 1 ? box.hi[0] : box.lo[0], i & 2 ? box.hi[1] : box.lo[1], i & 4 ? "
    "box.hi[2] : box.lo[2]]);\n",
    "  for (let i = 0; i < 4; i++)\n",
    "    pts.push([i & 1 ? grid.hi[0] : grid.lo[0], floorY, i & 2 ? grid.hi[1] : grid.lo[1]]);\n",
    "  for (let i = 0; i < 4; i++) {\n",
    "    fit(pts);\n",
    "    const M = matrix(basis()), B = basis(), k = 2 * cam.far * Math.tan(FOV / 2) / high;\n",
    "    const s = pts.map(function (p) { return screen(M, p); });\n",
    "    const mid = [0, 1].map(function (c) {\n",
    "      const v = s.map(function (q) { return q[c]; });\n",
    "      return (Math.min.apply(null, v) + Math.max.apply(null, v)) / 2;\n",
    "    });\n",
    "    for (let c = 0; c < 3; c++)\n",
    "      cam.at[c] += k * ((mid[0] - wide / 2) * B.r[c] - (mid[1] - high / 2) * B.u[c]);\n",
    "  }\n",
    "  fit(pts);\n",
    "  dirty = true;\n",
    "}\n",
    "function fit(pts) {\n",
    "  let a = 0.05 * box.size, b = 60 * box.size;\n",
    "  const mx = Math.min(44, 0.08 * wide), my = Math.min(24, 0.06 * high);\n",
    "  for (let i = 0; i < 40; i++) {\n",
    "    cam.far = Math.sqrt(a * b);\n",
    "    const M = matrix(basis());\n",
    "    const fits = pts.every(function (p) {\n",
    "      const s = screen(M, p);\n",
    "      return s[2] > 0 && s[0] > mx && s[0] < wide - mx && s[1] > my && s[1] < high - my;\n",
    "    });\n",
    "    if (fits) b = cam.far; else a = cam.far;\n",
    "  }\n",
    "  cam.far = b;\n",
    "}\n",
    "/* ---- drawing with WebGL: first the depth as the light sees it, then the picture ---- */\n",
    "const VS = 'attribute vec3 p,n;attribute vec3 c;uniform mat4 M,L;varying vec3 N,C,P;' +\n",
    "  'void main(){N=n;C=c;P=p;gl_Position=M*vec4(p,1.);}';\n",
    "/* depth in four bytes; lit() is the part of nine samples that the light reaches */\n",
    "const DS = 'precision highp float;varying vec3 N,C,P;void main(){' +\n",
    "  'vec4 e=fract(gl_FragCoord.z*vec4(1.,255.,65025.,16581375.));' +\n",
    "  'gl_FragColor=e-e.yzww*vec4(vec3(1./255.),0.);}';\n",
    "const FS = 'precision highp float;varying vec3 N,C,P;uniform vec3 eye,key,fill,texel;' +\n",
    "  'uniform vec4 rear,flat_;uniform mat4 L;uniform sampler2D map;' +\n",
    "  'float lit(vec3 p){vec3 s=(L*vec4(p,1.)).xyz*.5+.5;float k=0.;' +\n",
    "  'if(texel.x<=0.||s.x<=0.||s.y<=0.||s.x>=1.||s.y>=1.)return 1.;' +\n",
    "  'for(int i=-1;i<2;i++)for(int j=-1;j<2;j++)k+=step(min(s.z,1.)-texel.y,' +\n",
    "  'dot(texture2D(map,s.xy+1.4*texel.x*vec2(float(i),float(j))),' +\n",
    "  'vec4(1.,1./255.,1./65025.,1./16581375.)));return k/9.;}' +\n",
    "  'void main(){if(flat_.a<0.){' +\n",
    "  'gl_FragColor=vec4(0.,0.,0.,-flat_.a*(1.-lit(P)));return;}' +\n",
    "  'if(flat_.a>0.){gl_FragColor=vec4(flat_.rgb*flat_.a,flat_.a);return;}' +\n",
    "  'vec3 n=normalize(N),v=normalize(eye-P),b=C;' +\n",
    "  'if(!gl_FrontFacing){n=-n;b=mix(C,rear.rgb,rear.a);}b=pow(b,vec3(2.2));' +\n",
    "  'float d=dot(n,key),k=max(0.,d);k*=lit(P+n*texel.z);' +\n",
    "  'float f=max(0.,dot(n,fill)),h=.5+.5*n.y,e=pow(1.-abs(dot(n,v)),3.);' +\n",
    "  'float s=k*pow(max(0.,dot(n,normalize(key+v))),24.);' +\n",
    "  'vec3 o=b*(vec3(.13,.135,.145)+h*vec3(.1,.12,.14)+k*vec3(.68,.64,.58)' +\n",
    "  '+f*vec3(.33,.34,.36)+.05*e)+.03*s;gl_FragColor=vec4(pow(o,vec3(1./2.2)),1.);}';\n",
    "const MAP = 2048;               /* pixels of the light's picture along a side */\n",
    "let gl = null, pen = null, draws = null, light = null, loc = {}, mode = -1, dirty = true;\n",
    "function program(vertex, fragment) {\n",
    "  const p = gl.createProgram();\n",
    "  [vertex, fragment].forEach(function (text, i) {\n",
    "    const s = gl.createShader(i ? gl.FRAGMENT_SHADER : gl.VERTEX_SHADER);\n",
    "    gl.shaderSource(s, text);\n",
    "    gl.compileShader(s);\n",
    "    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new "
    "Error(gl.getShaderInfoLog(s));\n",
    "    gl.attachShader(p, s);\n",
    "  });\n",
    "  ['p', 'n', 'c'].forEach(function (a, i) { gl.bindAttribLocation(p, i, a); });\n",
    "  gl.linkProgram(p);\n",
    "  if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p));\n",
    "  return p;\n",
    "}\n",
    "function buffer(kind, data) {\n",
    "  const b = gl.createBuffer();\n",
    "  gl.bindBuffer(kind, b);\n",
    "  gl.bufferData(kind, data, gl.STATIC_DRAW);\n",
    "  return b;\n",
    "}\n",
    "/* The light stands still: where the page's first view has its upper left. It sees the "
    "box. */\n",
    "function lamp() {\n",
    "  const az = D.camera[0] * Math.PI / 180, c = Math.cos(az), s = Math.sin(az);\n",
    "  const k = [-0.6 * c + 0.36 * s, 0.7, 0.6 * s + 0.36 * c];\n",
    "  const l = Math.hypot(k[0], k[1], k[2]), b = k.map(function (v) { return v / l; });\n",
    "  const q = Math.hypot(b[0], b[2]), r = [b[2] / q, 0, -b[0] / q];\n",
    "  const u = [b[1] * r[2], b[2] * r[0] - b[0] * r[2], -b[1] * r[0]];\n",
    "  const m = new Float32Array(16), rows = [r, u, [-b[0], -b[1], -b[2]]];\n",
    "  let pixel = 0, deep = 1;\n",
    "  rows.forEach(function (v, i) {\n",
    "    let lo = 0, hi = 0;\n",
    "    for (let a = 0; a < 3; a++) {\n",
    "      lo += Math.min(v[a] * box.lo[a], v[a] * box.hi[a]);\n",
    "      hi += Math.max(v[a] * box.lo[a], v[a] * box.hi[a]);\n",
    "    }\n",
    "    const pad = 0.01 * box.size, w = hi - lo + 2 * pad;\n",
    "    for (let a = 0; a < 3; a++) m[4 * a + i] = 2 * v[a] / w;\n",
    "    m[12 + i] = -(hi + lo) / w;\n",
    "    if (i < 2) pixel = Math.max(pixel, w / MAP); else deep = w;\n",
    "  });\n",
    "  m[15] = 1;\n",
    "  return { b: b, m: m, pixel: pixel, deep: deep };\n",
    "}\n",
    "function initGL() {\n",
    "  draws = program(VS, FS);\n",
    "  ['M', 'L', 'eye', 'key', 'fill', 'rear', 'flat_', 'map', 'texel'].forEach(function (u) "
    "{\n",
    "    loc[u] = gl.getUniformLocation(draws, u);\n",
    "  });\n",
    "  light.program = program(VS, DS);\n",
    "  light.M = gl.getUniformLocation(light.program, 'M');\n",
    "  light.map = gl.createTexture();\n",
    "  gl.bindTexture(gl.TEXTURE_2D, light.map);\n",
    "  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, MAP, MAP, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);\n",
    "  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);\n",
    "  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);\n",
    "  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);\n",
    "  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);\n",
    "  light.frame = gl.createFramebuffer();\n",
    "  gl.bindFramebuffer(gl.FRAMEBUFFER, light.frame);\n",
    "  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, "
    "light.map, 0);\n",
    "  const depth = gl.createRenderbuffer();\n",
    "  gl.bindRenderbuffer(gl.RENDERBUFFER, depth);\n",
    "  gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT16, MAP, MAP);\n",
    "  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);\n",
    "  light.works = gl.checkFramebufferStatus(gl.FRAMEBUFFER) === gl.FRAMEBUFFER_COMPLETE;\n",
    "  gl.bindFramebuffer(gl.FRAMEBUFFER, null);\n",
    "  D.meshes.forEach(function (m) {\n",
    "    m.bt = buffer(gl.ELEMENT_ARRAY_BUFFER, m.tri);\n",
    "    m.bw = buffer(gl.ELEMENT_ARRAY_BUFFER, m.wire);\n",
    "    m.br = buffer(gl.ELEMENT_ARRAY_BUFFER, m.rim);\n",
    "    m.bp = gl.createBuffer(); m.bn = gl.createBuffer(); m.bc = gl.createBuffer();\n",
    "  });\n",
    "  grid.b = [buffer(gl.ARRAY_BUFFER, grid.thin), buffer(gl.ARRAY_BUFFER, grid.bold)];\n",
    "  const e = 2 * box.size, x0 = grid.lo[0] - e, x1 = grid.hi[0] + e;\n",
    "  const z0 = grid.lo[1] - e, z1 = grid.hi[1] + e, y = floorY;\n",
    "  light.floor = buffer(gl.ARRAY_BUFFER, new Float32Array(\n",
    "    [x0, y, z0, x1, y, z0, x0, y, z1, x1, y, z1]));\n",
    "  gl.enable(gl.DEPTH_TEST);\n",
    "  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);\n",
    "}\n",
    "function attrib(i, b, size, type) {\n",
    "  gl.bindBuffer(gl.ARRAY_BUFFER, b);\n",
    "  gl.enableVertexAttribArray(i);\n",
    "  gl.vertexAttribPointer(i, size, type, type === gl.UNSIGNED_BYTE, type === gl.FLOAT ? "
    "0 : 4, 0);\n",
    "}\n",
    "function bare() { gl.disableVertexAttribArray(1); gl.disableVertexAttribArray(2); }\n",
    "function feed(m) {\n",
    "  [[m.bp, m.pos], [m.bn, m.nrm], [m.bc, m.rgb]].forEach(function (x) {\n",
    "    gl.bindBuffer(gl.ARRAY_BUFFER, x[0]);\n",
    "    gl.bufferData(gl.ARRAY_BUFFER, x[1], gl.DYNAMIC_DRAW);\n",
    "  });\n",
    "}\n",
    "function ink(rgb, a) { gl.uniform4f(loc.flat_, rgb[0] / 255, rgb[1] / 255, rgb[2] / "
    "255, a); }\n",
    "function mix3(r, u, b, B) {\n",
    "  const k = [0, 1, 2].map(function (i) { return r * B.r[i] + u * B.u[i] + b * B.b[i]; });\n",
    "  const l = Math.hypot(k[0], k[1], k[2]);\n",
    "  return k.map(function (v) { return v / l; });\n",
    "}\n",
    "function elements(m, b, kind, n) {\n",
    "  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, b);\n",
    "  gl.drawElements(kind, n, gl.UNSIGNED_INT, 0);\n",
    "}\n",
    "function lightGL() {\n",
    "  gl.useProgram(light.program);\n",
    "  gl.bindFramebuffer(gl.FRAMEBUFFER, light.frame);\n",
    "  gl.viewport(0, 0, MAP, MAP);\n",
    "  gl.clearColor(1, 1, 1, 1);\n",
    "  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);\n",
    "  gl.disable(gl.BLEND);\n",
    "  gl.uniformMatrix4fv(light.M, false, light.m);\n",
    "  bare();\n",
    "  D.meshes.forEach(function (m) {\n",
    "    attrib(0, m.bp, 3, gl.FLOAT);\n",
    "    elements(m, m.bt, gl.TRIANGLES, m.tri.length);\n",
    "  });\n",
    "  gl.bindFramebuffer(gl.FRAMEBUFFER, null);\n",
    "}\n",
    "function drawGL(B, M) {\n",
    "  const c = css('--bg'), pale = dark.matches ? [255, 255, 255] : [0, 0, 0];\n",
    "  if (light.works) lightGL();\n",
    "  gl.useProgram(draws);\n",
    "  gl.viewport(0, 0, $('gl').width, $('gl').height);\n",
    "  gl.clearColor(c[0] / 255, c[1] / 255, c[2] / 255, 1);\n",
    "  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);\n",
    "  gl.uniformMatrix4fv(loc.M, false, M);\n",
    "  gl.uniformMatrix4fv(loc.L, false, light.m);\n",
    "  gl.uniform3f(loc.texel, light.works ? 1 / MAP : 0, 3 * light.pixel / light.deep,\n",
    "    4 * light.pixel);\n",
    "  gl.uniform3fv(loc.eye, B.eye);\n",
    "  gl.uniform3fv(loc.key, light.b);\n",
    "  gl.uniform3fv(loc.fill, mix3(0.3, -0.2, 0.9, B));\n",
    "  gl.enable(gl.BLEND);\n",
    "  bare();\n",
    "  const above = B.eye[1] > floorY;\n",
    "  gl.depthMask(!above);          /* seen from above the floor hides nothing */\n",
    "  if (above) {\n",
    "    attrib(0, light.floor, 3, gl.FLOAT);\n",
    "    ink([0, 0, 0], dark.matches ? -0.5 : -0.2);\n",
    "    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);\n",
    "  }\n",
    "  for (let i = 0; i < 2; i++) {\n",
    "    attrib(0, grid.b[i], 3, gl.FLOAT);\n",
    "    ink(pale, (dark.matches ? [0.07, 0.17] : [0.07, 0.2])[i]);\n",
    "    gl.drawArrays(gl.LINES, 0, (i ? grid.bold : grid.thin).length / 3);\n",
    "  }\n",
    "  gl.depthMask(true);\n",
    "  D.meshes.forEach(meshGL);\n",
    "}\n",
    "function meshGL(m) {\n",
    "  const r = rear(m);\n",
    "  attrib(0, m.bp, 3, gl.FLOAT); attrib(1, m.bn, 3, gl.FLOAT); attrib(2, m.bc, 3, "
    "gl.UNSIGNED_BYTE);\n",
    "  gl.uniform4f(loc.rear, r[0] / 255, r[1] / 255, r[2] / 255, r[3]);\n",
    "  gl.disable(gl.BLEND);\n",
    "  gl.enable(gl.POLYGON_OFFSET_FILL);\n",
    "  gl.polygonOffset(1, 1);\n",
    "  ink([0, 0, 0], 0);\n",
    "  elements(m, m.bt, gl.TRIANGLES, m.tri.length);\n",
    "  gl.disable(gl.POLYGON_OFFSET_FILL);\n",
    "  gl.enable(gl.BLEND);\n",
    "  if ($('wire').checked) { ink([0, 0, 0], 0.28); elements(m, m.bw, gl.LINES, "
    "m.wire.length); }\n",
    "  if (m.cloth) { ink([20, 24, 30], 0.6); elements(m, m.br, gl.LINES, m.rim.length); }\n",
    "}\n",
    "/* ---- drawing without WebGL: far faces first ---- */\n",
    "function draw2D(B, M) {\n",
    "  const c = pen, key = light.b, list = [];\n",
    "  c.setTransform(ratio, 0, 0, ratio, 0, 0);\n",
    "  c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--bg');\n",
    "  c.fillRect(0, 0, wide, high);\n",
    "  lines2D(M, grid.thin, 0.07);\n",
    "  lines2D(M, grid.bold, 0.18);\n",
    "  D.meshes.forEach(function (m) {\n",
    "    const n = m.nv, s = m.scr = m.scr || new Float32Array(3 * n);\n",
    "    const g = m.gnd = m.gnd || new Float32Array(2 * n);\n",
    "    for (let i = 0; i < n; i++) {\n",
    "      const p = [m.pos[3 * i], m.pos[3 * i + 1], m.pos[3 * i + 2]];\n",
    "      s.set(screen(M, p), 3 * i);\n",
    "      const k = (p[1] - floorY) / key[1];\n",
    "      for (let a = 0; a < 3; a++) p[a] -= k * key[a];\n",
    "      g.set(screen(M, p).slice(0, 2), 2 * i);\n",
    "    }\n",
    "    for (let f = 0; f < m.nf; f++) {\n",
    "      const a = m.tri[3 * f], b = m.tri[3 * f + 1], d = m.tri[3 * f + 2];\n",
    "      const back = m.cloth ? 0 : 0.09 * box.size;     /* cloth hides what it lies on */\n",
    "      list.push([s[3 * a + 2] + s[3 * b + 2] + s[3 * d + 2] + back, m, f]);\n",
    "    }\n",
    "  });\n",
    "  c.fillStyle = c.strokeStyle = dark.matches ? '#0d0f12' : '#d6d5d2';\n",
    "  if (B.eye[1] > floorY) D.meshes.forEach(function (m) {\n",
    "    for (let f = 0; f < m.nf; f++) path2D(m.gnd, 2, m.tri, f, true);\n",
    "  });\n",
    "  list.sort(function (a, b) { return b[0] - a[0]; });\n",
    "  list.forEach(function (e) { face2D(e[1], e[2], B, key); });\n",
    "}\n",
    "function lines2D(M, p, a) {\n",
    "  pen.strokeStyle = dark.matches ? 'rgba(255,255,255,' + a + ')' : 'rgba(0,0,0,' + a + "
    "')';\n",
    "  pen.lineWidth = 1;\n",
    "  pen.beginPath();\n",
    "  for (let i = 0; i < p.length; i += 6) {\n",
    "    const a = screen(M, [p[i], p[i + 1], p[i + 2]]), b = screen(M, [p[i + 3], p[i + 4], "
    "p[i + 5]]);\n",
    "    if (a[2] > 0 && b[2] > 0) { pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); }\n",
    "  }\n",
    "  pen.stroke();\n",
    "}\n",
    "function path2D(s, w, t, f, seam) {\n",
    "  const a = w * t[3 * f], b = w * t[3 * f + 1], c = w * t[3 * f + 2];\n",
    "  pen.beginPath();\n",
    "  pen.moveTo(s[a], s[a + 1]); pen.lineTo(s[b], s[b + 1]); pen.lineTo(s[c], s[c + 1]);\n",
    "  pen.closePath();\n",
    "  pen.fill();\n",
    "  if (seam) pen.stroke();\n",
    "}\n",
    "function face2D(m, f, B, key) {\n",
    "  const t = m.tri, a = t[3 * f], b = t[3 * f + 1], c = t[3 * f + 2], s = m.scr, r = "
    "rear(m);\n",
    "  if (s[3 * a + 2] <= 0 || s[3 * b + 2] <= 0 || s[3 * c + 2] <= 0) return;\n",
    "  const turn = (s[3 * b] - s[3 * a]) * (s[3 * c + 1] - s[3 * a + 1]) -\n",
    "    (s[3 * c] - s[3 * a]) * (s[3 * b + 1] - s[3 * a + 1]), sign = turn < 0 ? 1 : -1;\n",
    "  const n = [0, 1, 2].map(function (i) {\n",
    "    return sign * (m.nrm[3 * a + i] + m.nrm[3 * b + i] + m.nrm[3 * c + i]) / 3;\n",
    "  });\n",
    "  const k = Math.max(0, (dot(n, key) + 0.12) / 1.12), lum = 0.27 + 0.085 * n[1] + 0.8 * "
    "Math.pow(k, 1.5);\n",
    "  const rgb = [0, 1, 2].map(function (i) {\n",
    "    let v = (m.rgb[4 * a + i] + m.rgb[4 * b + i] + m.rgb[4 * c + i]) / 3;\n",
    "    if (sign < 0) v += (r[i] - v) * r[3];\n",
    "    return Math.min(255, Math.round(v * Math.pow(lum, 1 / 2.2)));\n",
    "  });\n",
    "  pen.fillStyle = 'rgb(' + rgb + ')';\n",
    "  pen.strokeStyle = $('wire').checked ? 'rgba(0,0,0,0.35)' : pen.fillStyle;\n",
    "  pen.lineWidth = 0.7;\n",
    "  path2D(s, 3, t, f, true);\n",
    "}\n",
    "/* ---- ticks in metres along the two floor edges that face the eye ---- */\n",
    "function css(name) {\n",
    "  const s = getComputedStyle(document.documentElement).getPropertyValue(name).trim();\n",
    "  return [1, 3, 5].map(function (i) { return parseInt(s.slice(i, i + 2), 16); });\n",
    "}\n",
    "function ticks(B, M) {\n",
    "  const c = $('ink').getContext('2d'), g = grid, mid = [0, 1].map(function (a) {\n",
    "    return (g.lo[a] + g.hi[a]) / 2;\n",
    "  });\n",
    "  c.setTransform(ratio, 0, 0, ratio, 0, 0);\n",
    "  c.clearRect(0, 0, wide, high);\n",
    "  if (B.eye[1] < floorY + 0.05 * cam.far) return;\n",
    "  c.font = '12px system-ui, Liberation Sans, sans-serif';\n",
    "  c.fillStyle = getComputedStyle(document.documentElement).getPropertyValue('--soft');\n",
    "  c.textAlign = 'center'; c.textBaseline = 'middle';\n",
    "  const digits = Math.max(0, -Math.floor(Math.log10(g.big) + 1e-9));\n",
    "  const taken = [];\n",
    "  for (let a = 0; a < 2; a++) {\n",
    "    const o = 1 - a, eye = o ? B.eye[2] : B.eye[0], up = eye > mid[o];\n",
    "    const flip = a === 1 && D.up === 2, last = Math.floor(g.hi[a] / g.big + 1e-6);\n",
    "    for (let i = Math.ceil(g.lo[a] / g.big - 1e-6); i <= last; i++) {\n",
    "      const p = [0, floorY, 0], q = [0, floorY, 0], edge = up ? g.hi[o] : g.lo[o];\n",
    "      p[2 * a] = q[2 * a] = i * g.big;\n",
    "      p[2 * o] = edge; q[2 * o] = edge + (up ? 0.1 : -0.1) * g.big;\n",
    "      const s = screen(M, p), e = screen(M, q), l = Math.hypot(e[0] - s[0], e[1] - s[1]) "
    "|| 1;\n",
    "      const axis = a === 0 ? 'x' : D.up === 2 ? 'y' : 'z';\n",
    "      const v = (flip ? -i : i) * g.big;\n",
    "      const text = (i === last ? axis + ' = ' : '') + (v === 0 ? 0 : v).toFixed(digits) + "
    "' m';\n",
    "      const half = c.measureText(text).width / 2 + 3, at = s[0] + (e[0] - s[0]) / l * 24;\n",
    "      const x = Math.min(wide - half, Math.max(half, at)), y = s[1] + (e[1] - s[1]) / l * "
    "13;\n",
    "      const free = taken.every(function (z) {\n",
    "        return Math.abs(z[0] - x) > 54 || Math.abs(z[1] - y) > 15;\n",
    "      });\n",
    "      if (s[2] > 0 && free) { c.fillText(text, x, y); taken.push([x, y]); }\n",
    "    }\n",
    "  }\n",
    "}\n",
    "/* ---- legend, clock, controls ---- */\n",
    "let now = T0, playing = false, lastTick = 0, ratio = 1;\n",
    "function digits(span) {\n",
    "  for (let d = 0; d < 6; d++) {\n",
    "    const k = span / 4 * Math.pow(10, d);\n",
    "    if (k > 0.5 && Math.abs(k - Math.round(k)) < 1e-6 * k) return d;\n",
    "  }\n",
    "  return Math.min(6, Math.max(0, 2 - Math.floor(Math.log10(Math.abs(span) || 1))));\n",
    "}\n",
    "function ramp(s) {\n",
    "  const stops = [];\n",
    "  for (let i = 0; i <= 16; i++)\n",
    "    stops.push('rgb(' + shade(s, i / 16).map(Math.round) + ') ' + i / 16 * 100 + '%');\n",
    "  return 'linear-gradient(90deg,' + stops + ')';\n",
    "}\n",
    "function legend() {\n",
    "  const s = D.scalars[mode];\n",
    "  $('legend').hidden = !s;\n",
    "  if (!s) return;\n",
    "  $('ramp').style.background = ramp(s);\n",
    "  $('what').textContent = s.name + (s.unit ? ' (' + s.unit + ')' : '');\n",
    "  $('scale').querySelectorAll('span').forEach(function (e) { e.remove(); });\n",
    "  const d = digits(s.hi - s.lo), w = Math.max(-s.lo, s.hi).toFixed(d).length;\n",
    "  const skip = w > 5 ? 2 : 1;    /* five numbers of six characters touch */\n",
    "  for (let i = 0; i <= 4; i += skip) {\n",
    "    const e = document.createElement('span'), v = s.lo + (s.hi - s.lo) * i / 4;\n",
    "    const cut = i === 0 && s.min < s.lo ? '\u2264 ' : i === 4 && s.max > s.hi ? '\u2265 ' "
    ": '';\n",
    "    e.style.left = i * 25 + '%';\n",
    "    e.textContent = cut + v.toFixed(d);\n",
    "    $('scale').appendChild(e);\n",
    "  }\n",
    "}\n",
    "function clock(at) {\n",
    "  const f = at[2] < 0.5 ? at[0] : at[1], s = D.scalars[mode];\n",
    "  const d = T1 - T0 < 1 ? 3 : 2;\n",
    "  $('clock').textContent = now.toFixed(d) + ' s of ' + T1.toFixed(d) + ' s \u00b7 frame ' "
    "+\n",
    "    (f + 1) + '/' + N;\n",
    "  if (document.activeElement !== $('scrub') || playing) $('scrub').value = f;\n",
    "  $('scrub').setAttribute('aria-valuetext', now.toFixed(d) + ' seconds');\n",
    "  if (s && s.ranges[f]) $('now').textContent = 'in this frame ' + "
    "s.ranges[f].map(function (v) {\n",
    "    return v.toFixed(Math.min(7, digits(s.hi - s.lo) + 1));\n",
    "  }).join(' to ');\n",
    "}\n",
    "function names() {\n",
    "  const box = $('names');\n",
    "  box.textContent = '';\n",
    "  box.hidden = D.meshes.length < 2;\n",
    "  box.style.display = box.hidden ? 'none' : '';\n",
    "  D.meshes.forEach(function (m) {\n",
    "    const e = document.createElement('span'), i = document.createElement('i'), c = "
    "plain(m);\n",
    "    i.className = 'chip';\n",
    "    i.style.background = mode >= 0 && m.sq[mode] ? ramp(D.scalars[mode])\n",
    "      : m.cloth ? 'linear-gradient(90deg,rgb(' + c.slice(0, 3) + ') 60%,rgb(' +\n",
    "        c.slice(3) + ') 60%)' : 'rgb(' + c.slice(0, 3) + ')';   /* front and back */\n",

    "    const size = document.createElement('span');\n",
    "    size.className = 'wide';\n",
    "    size.textContent = ' (' + m.nv + ' vertices, ' + m.nf + ' triangles)';\n",
    "    e.append(i, m.name, size);\n",
    "    box.append(e);\n",
    "  });\n",
    "}\n",
    "function setPlay(on) {\n",
    "  playing = on && N > 1;\n",
    "  if (playing && now >= T1) now = T0;\n",
    "  lastTick = 0;\n",
    "  $('icon').setAttribute('d', playing ? 'M6 4h4v16H6zM14 4h4v16h-4z' : 'M6 4v16l14-8z');\n",
    "  $('play').setAttribute('aria-label', playing ? 'Pause' : 'Play');\n",
    "  dirty = true;\n",
    "}\n",
    "function stepTo(f) {\n",
    "  setPlay(false);\n",
    "  now = D.times[Math.min(N - 1, Math.max(0, f))];\n",
    "  dirty = true;\n",
    "}\n",
    "function frameNow() { const a = locate(now); return a[2] < 0.5 ? a[0] : a[1]; }\n",
    "function resize() {\n",
    "  const r = $('stage').getBoundingClientRect();\n",
    "  if (r.width < 2 || r.height < 2) return;\n",
    "  const first = wide === 1, sharp = Math.min(2.5, devicePixelRatio || 1);\n",
    "  if (r.width === wide && r.height === high && sharp === ratio) return;\n",
    "  wide = r.width; high = r.height; ratio = sharp;\n",
    "  ['gl', 'ink'].forEach(function (id) {\n",
    "    $(id).width = Math.round(wide * ratio); $(id).height = Math.round(high * ratio);\n",
    "  });\n",
    "  if (first || !touched) reset();\n",
    "  dirty = true;\n",
    "  if (!first) draw();            /* a canvas of a new size is black until it is drawn */\n",
    "}\n",
    "let touched = false;\n",
    "function pointers() {\n",
    "  const el = $('gl'), live = new Map();\n",
    "  let gap = 0, mid = null;\n",
    "  function turn(dx, dy) {\n",
    "    cam.az -= dx * 0.008;\n",
    "    cam.el = Math.min(1.55, Math.max(-1.55, cam.el + dy * 0.008));\n",
    "  }\n",
    "  function pan(dx, dy) {\n",
    "    const B = basis(), s = 2 * cam.far * Math.tan(FOV / 2) / high;\n",
    "    for (let i = 0; i < 3; i++) cam.at[i] += s * (dy * B.u[i] - dx * B.r[i]);\n",
    "  }\n",
    "  function zoom(k) {\n",
    "    cam.far = Math.min(80 * box.size, Math.max(0.02 * box.size, cam.far * k));\n",
    "  }\n",
    "  function pair() {\n",
    "    const p = Array.from(live.values());\n",
    "    gap = Math.hypot(p[0].x - p[1].x, p[0].y - p[1].y);\n",
    "    mid = [(p[0].x + p[1].x) / 2, (p[0].y + p[1].y) / 2];\n",
    "  }\n",
    "  el.onpointerdown = function (e) {\n",
    "    el.setPointerCapture(e.pointerId);\n",
    "    live.set(e.pointerId, { x: e.clientX, y: e.clientY });\n",
    "    if (live.size === 2) pair();\n",
    "  };\n",
    "  el.onpointermove = function (e) {\n",
    "    const o = live.get(e.pointerId);\n",
    "    if (!o) return;\n",
    "    const dx = e.clientX - o.x, dy = e.clientY - o.y;\n",
    "    live.set(e.pointerId, { x: e.clientX, y: e.clientY });\n",
    "    if (live.size === 1) (e.buttons & 6 || e.shiftKey ? pan : turn)(dx, dy);\n",
    "    else if (live.size === 2) {\n",
    "      const g = gap, m = mid;\n",
    "      pair();\n",
    "      if (g > 0 && gap > 0) zoom(g / gap);\n",
    "      pan(mid[0] - m[0], mid[1] - m[1]);\n",
    "    }\n",
    "    touched = dirty = true;\n",
    "  };\n",
    "  el.onpointerup = el.onpointercancel = function (e) { live.delete(e.pointerId); };\n",
    "  el.oncontextmenu = function (e) { e.preventDefault(); };\n",
    "  el.ondblclick = function () { touched = false; reset(); };\n",
    "  el.addEventListener('wheel', function (e) {\n",
    "    e.preventDefault();\n",
    "    zoom(Math.exp(e.deltaY * (e.deltaMode === 1 ? 0.05 : 0.0015)));\n",
    "    touched = dirty = true;\n",
    "  }, { passive: false });\n",
    "}\n",
    "function keys(e) {\n",
    "  const tag = e.target.tagName, f = frameNow();\n",
    "  if (e.ctrlKey || e.metaKey || e.altKey || tag === 'SELECT') return;\n",
    "  if (tag === 'INPUT' && e.key.slice(0, 5) === 'Arrow') return;\n",
    "  if ((tag === 'BUTTON' || e.target.type === 'checkbox') && e.key === ' ') return;\n",
    "  if (e.key === ' ') setPlay(!playing);\n",
    "  else if (e.key === 'ArrowLeft') stepTo(f - 1);\n",
    "  else if (e.key === 'ArrowRight') stepTo(f + 1);\n",
    "  else if (e.key === 'ArrowUp') { cam.far /= 1.1; touched = dirty = true; }\n",
    "  else if (e.key === 'ArrowDown') { cam.far *= 1.1; touched = dirty = true; }\n",
    "  else if (e.key === 'Home') stepTo(0);\n",
    "  else if (e.key === 'End') stepTo(N - 1);\n",
    "  else if (e.key === 'r' || e.key === 'R') { touched = false; reset(); }\n",
    "  else return;\n",
    "  e.preventDefault();\n",
    "}\n",
    "function controls() {\n",
    "  const pickColour = $('colour');\n",
    "  D.scalars.concat([{ name: 'plain' }]).forEach(function (s, i) {\n",
    "    const o = document.createElement('option');\n",
    "    o.value = i < D.scalars.length ? i : -1;\n",
    "    o.textContent = s.name;\n",
    "    pickColour.appendChild(o);\n",
    "  });\n",
    "  mode = D.scalars.length ? 0 : -1;\n",
    "  $('colourbox').hidden = !D.scalars.length;\n",
    "  if (!D.scalars.length) $('colourbox').style.display = 'none';\n",
    "  pickColour.onchange = function () {\n",
    "    mode = +pickColour.value;\n",
    "    legend(); names();\n",
    "    dirty = true;\n",
    "  };\n",
    "  $('play').onclick = function () { setPlay(!playing); };\n",
    "  $('back').onclick = function () { stepTo(frameNow() - 1); };\n",
    "  $('next').onclick = function () { stepTo(frameNow() + 1); };\n",
    "  $('home').onclick = function () { touched = false; reset(); };\n",
    "  $('wire').onchange = function () { dirty = true; };\n",
    "  $('scrub').max = N - 1;\n",
    "  $('scrub').oninput = function () { stepTo(+$('scrub').value); };\n",
    "  document.addEventListener('keydown', keys);\n",
    "  dark.addEventListener('change', function () { names(); dirty = true; });\n",
    "  new ResizeObserver(resize).observe($('stage'));\n",
    "  pointers();\n",
    "}\n",
    "function draw() {\n",
    "  const at = locate(now), B = basis(), M = matrix(B);\n",
    "  D.meshes.forEach(function (m) {\n",
    "    place(m, at);\n",
    "    paint(m, at, mode);\n",
    "    if (gl) feed(m);\n",
    "  });\n",
    "  if (gl) drawGL(B, M); else draw2D(B, M);\n",
    "  ticks(B, M);\n",
    "  clock(at);\n",
    "}\n",
    "function tick(ms) {\n",
    "  try {\n",
    "    if (playing) {\n",
    "      if (lastTick) now += Math.min(0.25, (ms - lastTick) / 1000) * +$('speed').value;\n",
    "      if (now > T1) now = T0 + (now - T1) % ((T1 - T0) || 1);\n",
    "      lastTick = ms;\n",
    "      dirty = true;\n",
    "    }\n",
    "    if (dirty) {\n",
    "      dirty = false;\n",
    "      draw();\n",
    "      if (document.title === 'loading') document.title = 'ready ' + N + ' frames';\n",
    "    }\n",
    "    requestAnimationFrame(tick);\n",
    "  } catch (e) { fail(e); }\n",
    "}\n",
    "function start() {\n",
    "  const hash = location.hash, want = /[#&]t=([0-9.eE+-]+)/.exec(hash);\n",
    "  $('head').textContent = D.title;\n",
    "  $('caption').textContent = D.caption;\n",
    "  $('note').textContent = D.note;\n",
    "  $('gl').setAttribute('aria-label', 'Moving picture: ' + D.title + '. ' + D.caption +\n",
    "    ' Drag to turn, wheel or pinch to zoom, right button or two fingers to move. ' +\n",
    "    'Space plays, left and right arrows step.');\n",
    "  if (!N || !D.meshes.length) throw new Error('no frames');\n",
    "  D.meshes.forEach(decode);\n",
    "  D.scalars.forEach(table);\n",
    "  bounds();\n",
    "  light = lamp();\n",
    "  if (!/[#&]2d/.test(hash)) {\n",
    "    gl = $('gl').getContext('webgl', { antialias: true, alpha: false });\n",
    "    if (gl && !gl.getExtension('OES_element_index_uint')) gl = null;\n",
    "  }\n",
    "  if (gl) initGL(); else pen = $('gl').getContext('2d');\n",
    "  if (!gl && !pen) throw new Error('neither WebGL nor a 2D canvas');\n",
    "  $('gl').addEventListener('webglcontextlost', function (e) { e.preventDefault(); });\n",
    "  $('gl').addEventListener('webglcontextrestored', function () { initGL(); dirty = true; "
    "});\n",
    "  window.addEventListener('hashchange', function () { location.reload(); });\n",
    "  controls(); legend(); names(); resize();\n",
    "  if (want) now = Math.min(T1, Math.max(T0, parseFloat(want[1]) || 0));\n",
    "  else setPlay(!matchMedia('(prefers-reduced-motion: reduce)').matches);\n",
    "  requestAnimationFrame(tick);\n",
    "}\n",
    "try { start(); } catch (e) { fail(e); }\n",
    "</script></body></html>\n",
    NULL
};

/* ===== text and bits ===================================================================== */

static inline void view_bytes(view_buffer *b, const char *text, size_t n) {
    if (b->failed || b->full) return;
    if (n > b->limit - b->n) {
        b->full = 1;
        return;
    }
    if (n > b->cap - b->n) {
        size_t cap = b->cap < 65536 ? 65536 : b->cap;
        while (cap < b->n + n) cap *= 2;
        char *p = (char *)realloc(b->p, cap);
        if (p == NULL) {
            b->failed = 1;
            return;
        }
        b->p = p;
        b->cap = cap;
    }
    memcpy(b->p + b->n, text, n);
    b->n += n;
}

static inline void view_text(view_buffer *b, const char *text) {
    view_bytes(b, text, strlen(text));
}

static inline void view_number(view_buffer *b, double v) {
    char text[40];
    snprintf(text, sizeof text, "%.9g", v);
    view_text(b, text);
}

/* a JavaScript string; '<' is escaped so that no text can end the script */
static inline void view_quote(view_buffer *b, const char *s) {
    char code[8];
    view_text(b, "\"");
    for (; *s != '\0'; s++) {
        unsigned char c = (unsigned char)*s;
        if (c < 32 || c == '"' || c == '\\' || c == '<') {
            snprintf(code, sizeof code, "\\u%04x", (unsigned)c);
            view_text(b, code);
        } else view_bytes(b, s, 1);
    }
    view_text(b, "\"");
}

/* base64 with - and . for h and H, so that no data can spell an address */
static inline void view_base64(view_buffer *b, unsigned byte) {
    static const char digit[] =
        "ABCDEFG.IJKLMNOPQRSTUVWXYZabcdefg-ijklmnopqrstuvwxyz0123456789+/";
    char four[4];
    b->group = b->group << 8 | byte;
    if (++b->waiting < 3) return;
    for (int i = 0; i < 4; i++) four[i] = digit[b->group >> (18 - 6 * i) & 63u];
    view_bytes(b, four, 4);
    b->group = 0;
    b->waiting = 0;
}

/* the low n <= 24 bits of v, most significant first */
static inline void view_bits(view_buffer *b, unsigned v, int n) {
    b->acc = b->acc << n | (v & ((1u << n) - 1u));
    b->bits += n;
    while (b->bits >= 8) {
        b->bits -= 8;
        view_base64(b, b->acc >> b->bits & 255u);
    }
    b->acc &= (1u << b->bits) - 1u;
}

/* fills the last group with zeros, which the reader never looks at */
static inline void view_bits_end(view_buffer *b) {
    if (b->bits > 0) view_bits(b, 0, 8 - b->bits);
    while (b->waiting != 0) view_base64(b, 0);
}

/* Rice codes of r [n]; k near log2 of the block's mean is within a fraction of a bit */
static inline void view_rice(view_buffer *b, const int *r, int n) {
    for (int i = 0; i < n; i += 32) {
        int k = 0, end = i + 32 < n ? i + 32 : n;
        double sum = 0;
        for (int j = i; j < end; j++) sum += 2.0 * fabs((double)r[j]);
        while (k < 15 && ldexp((double)(end - i), k) < 0.7 * sum) k++;
        view_bits(b, (unsigned)k, 4);
        for (int j = i; j < end; j++) {
            unsigned u = r[j] < 0 ? 2u * (unsigned)-(r[j] + 1) + 1u : 2u * (unsigned)r[j];
            unsigned q = u >> k;
            if (q < 20) {
                if (q > 0) view_bits(b, (1u << q) - 1u, (int)q);
                view_bits(b, 0, 1);
                if (k > 0) view_bits(b, u, k);
            } else {
                view_bits(b, (1u << 20) - 1u, 20);
                view_bits(b, u, 24);
            }
        }
    }
}

/* one row x [n] after the rows a and b; r [n] is scratch */
static inline void view_row(view_buffer *out, const int *x, const int *a, const int *b, int n,
                            int *r) {
    static const int ca[5] = {0, 1, 2, 1, 2}, cb[5] = {0, 0, 1, 0, 1};
    double best = HUGE_VAL;
    int mode = 0;
    for (int pass = 0; pass < 6; pass++) {
        int p = pass < 5 ? pass : mode, last = 0;
        double sum = 0;
        for (int i = 0; i < n; i++) {
            int d = x[i] - ca[p] * a[i] + cb[p] * b[i];
            r[i] = p == 0 || p > 2 ? d - last : d;
            last = d;
            sum += fabs((double)r[i]);
        }
        if (pass < 5 && sum < best) {
            best = sum;
            mode = p;
        }
    }
    view_bits(out, (unsigned)mode, 3);
    view_rice(out, r, n);
}

/* ===== building up a view ================================================================ */

static inline char *view_copy(const char *s) {
    size_t n = strlen(s ? s : "") + 1;
    char *p = (char *)malloc(n);
    if (p != NULL) memcpy(p, s ? s : "", n);
    return p;
}

static inline void view_fail(view *v, const char *error) {
    if (v->error == NULL) v->error = error;
}

static inline void view_free(view *v) {
    if (v == NULL) return;
    for (int m = 0; m < v->nmesh; m++) {
        view_body *b = &v->mesh[m];
        free(b->name);
        free(b->faces);
        free(b->x.data);
        free(b->s[0].data);
        free(b->s[1].data);
        free(b->put);
    }
    for (int k = 0; k < 2; k++) {
        free(v->legend[k].name);
        free(v->legend[k].unit);
    }
    free(v->title);
    free(v->caption);
    free(v->t);
    free(v);
}

/* A new view, or NULL when there is no memory. Title and caption are plain text. */
static inline view *view_open(const char *title, const char *caption) {
    view *v = (view *)calloc(1, sizeof *v);
    if (v == NULL) return NULL;
    v->up = 1;
    v->azimuth = 28;
    v->elevation = 14;
    v->floor = (double)NAN;
    v->title = view_copy(title);
    v->caption = view_copy(caption);
    if (v->title == NULL || v->caption == NULL) {
        view_free(v);
        return NULL;
    }
    return v;
}

/* Another caption, for figures that are known only after the run. */
static inline void view_caption(view *v, const char *caption) {
    char *copy = v != NULL ? view_copy(caption) : NULL;
    if (v == NULL) return;
    if (copy == NULL) {
        view_fail(v, "out of memory");
        return;
    }
    free(v->caption);
    v->caption = copy;
}

/* The axis that points up: 1 for y (the default), 2 for z. */
static inline void view_up(view *v, int axis) {
    if (v != NULL) v->up = axis == 2 ? 2 : 1;
}

/* First view, degrees: azimuth 0 looks from the front (+z, or -y with z up), 90 from +x. */
static inline void view_camera(view *v, double azimuth, double elevation) {
    if (v == NULL || !isfinite(azimuth) || !isfinite(elevation)) return;
    v->azimuth = azimuth;
    v->elevation = elevation;
}

/* Height of the floor grid, m. Default: 0 where the meshes stand on it, else just below them. */
static inline void view_floor(view *v, double height) {
    if (v != NULL) v->floor = height;
}

/* Adds a mesh of faces [nf x 3] before the first frame; returns its number, -1 on error. */
static inline int view_mesh(view *v, const char *name, view_kind kind, int nv, int nf,
                            const int *faces) {
    if (v == NULL) return -1;
    if (v->nmesh == VIEW_MAX_MESHES || v->frames > 0 || faces == NULL || nv < 3 || nf < 1 ||
        nv > VIEW_MAX_INDEX || nf > VIEW_MAX_INDEX / 3) {
        view_fail(v, "view_mesh: too many meshes, a bad size, or called after a frame");
        return -1;
    }
    for (int i = 0; i < 3 * nf; i++) if (faces[i] < 0 || faces[i] >= nv) {
        view_fail(v, "view_mesh: a face has an index that is no vertex");
        return -1;
    }
    view_body *b = &v->mesh[v->nmesh];
    b->name = view_copy(name);
    b->faces = (int *)malloc(3 * (size_t)nf * sizeof *b->faces);
    if (b->name == NULL || b->faces == NULL) {
        free(b->name);
        free(b->faces);
        memset(b, 0, sizeof *b);
        view_fail(v, "out of memory");
        return -1;
    }
    memcpy(b->faces, faces, 3 * (size_t)nf * sizeof *b->faces);
    b->kind = kind;
    b->nv = nv;
    b->nf = nf;
    b->x.width = 3 * (size_t)nv;
    for (int c = 0; c < 3; c++) {
        b->lo[c] = HUGE_VAL;
        b->hi[c] = -HUGE_VAL;
    }
    return v->nmesh++;
}

/* Names scalar 0 (drawn first) or 1 (chosen in the page) before the first frame. The colours
 * run from lo to hi; with lo < mid < hi they part at mid (blue below, red above), else they
 * rise from lo. lo >= hi: the range is taken from the data (99.5 % of it), about mid if finite. */
static inline void view_scalar(view *v, int which, const char *name, const char *unit,
                               view_where where, double lo, double mid, double hi) {
    if (v == NULL) return;
    if (which < 0 || which > 1 || v->frames > 0 || v->legend[which].name != NULL ||
        !isfinite(lo) || !isfinite(hi)) {
        view_fail(v, "view_scalar: a bad number, called twice or after a frame");
        return;
    }
    view_legend *l = &v->legend[which];
    l->name = view_copy(name);
    l->unit = view_copy(unit);
    if (l->name == NULL || l->unit == NULL) view_fail(v, "out of memory");
    l->where = where;
    l->lo = lo;
    l->mid = mid;
    l->hi = hi;
    l->least = HUGE_VAL;
    l->most = -HUGE_VAL;
    for (int m = 0; m < v->nmesh; m++)
        v->mesh[m].s[which].width = (size_t)(where == VIEW_FACE ? v->mesh[m].nf : v->mesh[m].nv);
}

/* room for one more row; NULL (and the error kept) when there is none */
static inline float *view_more(view *v, view_rows *r) {
    if (r->count == r->cap) {
        int cap = r->cap < 8 ? 8 : 2 * r->cap;
        float *p = NULL;
        if ((size_t)cap <= (size_t)-1 / (4 * r->width + 4))
            p = (float *)realloc(r->data, (size_t)cap * r->width * sizeof *p);
        if (p == NULL) {
            view_fail(v, "out of memory");
            return NULL;
        }
        r->data = p;
        r->cap = cap;
    }
    return r->data + (size_t)r->count++ * r->width;
}

/* Begins a frame at time t (s), later than the frame before. */
static inline void view_time(view *v, double t) {
    if (v == NULL || v->error != NULL) return;
    if (!isfinite(t) || (v->frames > 0 && !(t > v->t[v->frames - 1]))) {
        view_fail(v, "view_time: times must be finite and rise");
        return;
    }
    if (v->frames == v->cap) {
        int cap = v->cap < 64 ? 64 : 2 * v->cap;
        double *p = (double *)realloc(v->t, (size_t)cap * sizeof *p);
        if (p != NULL) v->t = p;
        for (int m = 0; m < v->nmesh && p != NULL; m++) {
            int *q = (int *)realloc(v->mesh[m].put, (size_t)cap * sizeof *q);
            if (q == NULL) p = NULL;
            else v->mesh[m].put = q;
        }
        if (p == NULL) {
            view_fail(v, "out of memory");
            return;
        }
        v->cap = cap;
    }
    for (int m = 0; m < v->nmesh; m++) v->mesh[m].put[v->frames] = v->mesh[m].x.count - 1;
    v->t[v->frames++] = t;
}

static inline void view_put_scalar(view *v, view_body *b, int k, const double *s) {
    view_legend *l = &v->legend[k];
    if (l->name == NULL || (s == NULL && b->s[k].count == 0)) return;
    if (b->s[k].width == 0)
        b->s[k].width = (size_t)(l->where == VIEW_FACE ? b->nf : b->nv);
    if (b->s[k].count < b->x.count - 1) {
        view_fail(v, "view_put: a scalar must be given from a mesh's first frame on");
        return;
    }
    float *p = view_more(v, &b->s[k]);
    if (p == NULL) return;
    for (size_t i = 0; i < b->s[k].width; i++) {
        double value = s != NULL ? s[i] : 0;
        if (!isfinite(value)) {
            value = isfinite(l->mid) ? l->mid : 0;
            v->held++;
        } else {
            l->least = value < l->least ? value : l->least;
            l->most = value > l->most ? value : l->most;
        }
        p[i] = (float)value;
    }
}

/* What mesh m shows from this frame on: x [nv x 3] m; s0 and s1 are the scalars, [nv] or [nf] as
 * view_scalar says, or NULL where the mesh has none. A coordinate that is not finite keeps its
 * last value, and the page counts it. */
static inline void view_put(view *v, int m, const double *x, const double *s0, const double *s1) {
    if (v == NULL || v->error != NULL) return;
    if (m < 0 || m >= v->nmesh || x == NULL || v->frames == 0) {
        view_fail(v, "view_put: no such mesh, no positions, or no view_time before it");
        return;
    }
    view_body *b = &v->mesh[m];
    if (b->last == v->frames) {
        view_fail(v, "view_put: the mesh was put twice in one frame");
        return;
    }
    float *p = view_more(v, &b->x);
    if (p == NULL) return;
    const float *before = b->x.count > 1 ? p - b->x.width : NULL;
    for (size_t i = 0; i < b->x.width; i++) {
        double value = x[i];
        int c = (int)(i % 3);
        if (!isfinite(value) || fabs(value) > 1e30) {
            value = before != NULL ? (double)before[i] : 0;
            v->held++;
        }
        b->lo[c] = value < b->lo[c] ? value : b->lo[c];
        b->hi[c] = value > b->hi[c] ? value : b->hi[c];
        p[i] = (float)value;
    }
    b->put[v->frames - 1] = b->x.count - 1;
    b->last = v->frames;
    view_put_scalar(v, b, 0, s0);
    view_put_scalar(v, b, 1, s1);
}

/* --- a ball: an obstacle of 24 x 12 patches, for spheres --- */

#define VIEW_BALL_NV 266            /* two poles and 11 rings of 24 */
#define VIEW_BALL_NF 528

/* Adds a ball before the first frame; returns its number, -1 on error. */
static inline int view_ball(view *v, const char *name) {
    int faces[3 * VIEW_BALL_NF], n = 0;
    for (int j = 0; j < 12; j++) for (int i = 0; i < 24; i++) {
        int a = 24 * (j - 1) + i, b = 24 * (j - 1) + (i + 1) % 24;  /* of the ring above */
        if (j > 0) {
            faces[n++] = a;
            faces[n++] = j < 11 ? a + 24 : 265;
            faces[n++] = b;
        }
        if (j < 11) {
            faces[n++] = j > 0 ? b : 264;
            faces[n++] = a + 24;
            faces[n++] = b + 24;
        }
    }
    return view_mesh(v, name, VIEW_OBSTACLE, VIEW_BALL_NV, VIEW_BALL_NF, faces);
}

/* Puts ball m around c, radius r, m. */
static inline void view_put_ball(view *v, int m, const double c[3], double r) {
    double x[3 * VIEW_BALL_NV];
    for (int i = 0; i < VIEW_BALL_NV; i++) {
        double up = i < 264 ? (i / 24 + 1) / 12.0 : i - 264, around = i % 24 / 12.0;
        x[3 * i] = c[0] + r * sin(3.14159265358979 * up) * cos(3.14159265358979 * around);
        x[3 * i + 1] = c[1] + r * cos(3.14159265358979 * up);
        x[3 * i + 2] = c[2] - r * sin(3.14159265358979 * up) * sin(3.14159265358979 * around);
    }
    view_put(v, m, x, NULL, NULL);
}

/* The short form for one mesh (number 0): a frame at t with x [nv x 3] and scalar 0 or NULL. */
static inline void view_frame(view *v, double t, const double *x, const double *s) {
    view_time(v, t);
    view_put(v, 0, x, s, NULL);
}

/* s [nf]: the principal stretch farthest from 1 (on a log scale) of each triangle, from rest
 * corners X [nf x 3 x 2] m and positions x [nv x 3] m. With F = dx/dX, C = F'F has the squared
 * stretches as eigenvalues: mean +- sqrt(half difference^2 + C12^2). */
static inline void view_stretch(int nf, const int *faces, const double *x, const double *X,
                                double *s) {
    for (int f = 0; f < nf; f++) {
        const double *a = x + 3 * faces[3 * f], *b = x + 3 * faces[3 * f + 1];
        const double *c = x + 3 * faces[3 * f + 2], *R = X + 6 * f;
        double p = R[2] - R[0], q = R[3] - R[1], r = R[4] - R[0], t = R[5] - R[1];
        double det = p * t - q * r, c11 = 0, c12 = 0, c22 = 0;
        for (int i = 0; i < 3; i++) {
            double u = b[i] - a[i], w = c[i] - a[i];
            double f1 = (u * t - w * q) / det, f2 = (w * p - u * r) / det;
            c11 += f1 * f1;
            c12 += f1 * f2;
            c22 += f2 * f2;
        }
        double mean = 0.5 * (c11 + c22), rad = sqrt(0.25 * (c11 - c22) * (c11 - c22) + c12 * c12);
        double most = sqrt(mean + rad), least = sqrt(mean > rad ? mean - rad : 0);
        s[f] = most * least > 1 ? most : least;
    }
}

/* ===== writing =========================================================================== */

/* the range that holds 99.5 % of scalar k: a histogram of the distance from mid or from least */
static inline void view_range(view *v, int k) {
    view_legend *l = &v->legend[k];
    int two = isfinite(l->mid) && (l->lo < l->hi ? l->lo < l->mid && l->mid < l->hi
                                                 : l->least < l->mid);
    if (!(l->least <= l->most)) l->least = l->most = isfinite(l->mid) ? l->mid : 0;
    if (l->lo < l->hi) {
        if (!two) l->mid = (double)NAN;
        return;
    }
    double from = two ? l->mid : l->least, reach = l->most - from, total = 0, sum = 0;
    double count[1024];
    int i = 0;
    memset(count, 0, sizeof count);
    if (two && l->mid - l->least > reach) reach = l->mid - l->least;
    if (!(reach > 1e-12)) reach = 1e-12;
    for (int m = 0; m < v->nmesh; m++) {
        const view_rows *r = &v->mesh[m].s[k];
        for (size_t j = 0; j < r->width * (size_t)r->count; j++) {
            double d = fabs((double)r->data[j] - from) / reach * 1023;
            count[d < 1023 ? (int)d : 1023]++;
            total++;
        }
    }
    while (i < 1023 && (sum += count[i]) < 0.995 * total) i++;
    double want = reach * (i + 1) / 1024, p = pow(10, floor(log10(want)));
    double nice = want / p > 5 ? 10 * p : want / p > 2 ? 5 * p : want / p > 1 ? 2 * p : p;
    l->lo = two ? l->mid - nice : from;
    l->hi = from + nice;
    if (!two) l->mid = (double)NAN;
}

/* the rows of one array, quantised to 0..levels by (value - lo) / step per part */
static inline void view_stream(view_buffer *out, const view_rows *r, const int *put, int frames,
                               int stride, int parts, const double *lo, const double *step,
                               int levels, int *q) {
    int n = (int)r->width / parts, still = r->count < 2, width = (int)r->width;
    int *now = q, *a = q + width, *b = q + 2 * width, *scratch = q + 3 * width;
    out->acc = out->group = 0;
    out->bits = out->waiting = 0;
    memset(q, 0, 3 * r->width * sizeof *q);
    for (int f = 0, done = 0; f < frames && !out->full && !out->failed; f += stride, done++) {
        int at = put[f] < 0 ? 0 : put[f];
        const float *row = r->data + (size_t)at * r->width;
        for (int i = 0; i < width; i++) {
            int c = i % parts;
            double u = step[c] > 0 ? floor(((double)row[i] - lo[c]) / step[c] + 0.5) : 0;
            now[c * n + i / parts] = u < 0 ? 0 : u > levels ? levels : (int)u;
        }
        for (int c = 0; c < parts; c++)
            view_row(out, now + c * n, a + c * n, (done > 1 ? b : a) + c * n, n, scratch);
        int *spare = b;
        b = a;
        a = now;
        now = spare;
        if (still) break;
    }
    view_bits_end(out);
}

static inline void view_write_scalar(view_buffer *out, const view *v, const view_body *b, int k,
                                     int stride, int *q) {
    const view_legend *l = &v->legend[k];
    double step = (l->hi - l->lo) / 255;
    if (b->s[k].count == 0) {
        view_text(out, "null");
        return;
    }
    view_text(out, l->where == VIEW_FACE ? "{face:true,frames:" : "{face:false,frames:");
    view_number(out, b->s[k].count < 2 ? 1 : (v->frames + stride - 1) / stride);
    view_text(out, ",data:'");
    view_stream(out, &b->s[k], b->put, v->frames, stride, 1, &l->lo, &step, 255, q);
    view_text(out, "'}");
}

static inline void view_write_mesh(view_buffer *out, const view *v, int m, int stride, int bits,
                                   int *q) {
    const view_body *b = &v->mesh[m];
    int levels = (1 << bits) - 1, tone = 0, last = 0;
    double step[3];
    for (int i = 0; i < m; i++) tone += v->mesh[i].kind == VIEW_CLOTH;
    view_text(out, "{name:");
    view_quote(out, b->name);
    view_text(out, b->kind == VIEW_CLOTH ? ",cloth:true,tone:" : ",cloth:false,tone:");
    view_number(out, tone);
    view_text(out, ",nv:");
    view_number(out, b->nv);
    view_text(out, ",nf:");
    view_number(out, b->nf);
    view_text(out, ",frames:");
    view_number(out, b->x.count < 2 ? 1 : (v->frames + stride - 1) / stride);
    view_text(out, ",levels:");
    view_number(out, levels);
    for (int k = 0; k < 2; k++) {
        view_text(out, k == 0 ? ",lo:[" : ",step:[");
        for (int c = 0; c < 3; c++) {
            step[c] = (b->hi[c] - b->lo[c]) / levels;
            view_number(out, k == 0 ? b->lo[c] : step[c]);
            view_text(out, c < 2 ? "," : "]");
        }
    }
    view_text(out, ",\nfaces:'");
    for (int i = 0; i < 3 * b->nf; i++) {
        q[i] = b->faces[i] - last;
        last = b->faces[i];
    }
    out->acc = out->group = 0;
    out->bits = out->waiting = 0;
    view_rice(out, q, 3 * b->nf);
    view_bits_end(out);
    view_text(out, "',\nx:'");
    view_stream(out, &b->x, b->put, v->frames, stride, 3, b->lo, step, levels, q);
    view_text(out, "',\ns:[");
    view_write_scalar(out, v, b, 0, stride, q);
    view_text(out, ",\n");
    view_write_scalar(out, v, b, 1, stride, q);
    view_text(out, "]}");
}

/* least and most of scalar k in one frame, over all meshes */
static inline void view_write_extent(view_buffer *out, const view *v, int k, int f) {
    double lo = HUGE_VAL, hi = -HUGE_VAL;
    for (int m = 0; m < v->nmesh; m++) {
        const view_body *b = &v->mesh[m];
        const view_rows *r = &b->s[k];
        int at = b->put[f] < r->count ? b->put[f] : r->count - 1;
        for (size_t i = 0; at >= 0 && i < r->width; i++) {
            double value = (double)r->data[(size_t)at * r->width + i];
            lo = value < lo ? value : lo;
            hi = value > hi ? value : hi;
        }
    }
    if (lo > hi) lo = hi = 0;
    view_text(out, "[");
    view_number(out, lo);
    view_text(out, ",");
    view_number(out, hi);
    view_text(out, "],");
}

static inline void view_write_legend(view_buffer *out, const view *v, int k, int stride) {
    const view_legend *l = &v->legend[k];
    static const char *const key[5] = {",lo:", ",mid:", ",hi:", ",min:", ",max:"};
    double value[5];
    value[0] = l->lo;
    value[1] = isfinite(l->mid) ? l->mid : l->lo;
    value[2] = l->hi;
    value[3] = l->least;
    value[4] = l->most;
    view_text(out, "{name:");
    view_quote(out, l->name);
    view_text(out, ",unit:");
    view_quote(out, l->unit);
    view_text(out, isfinite(l->mid) ? ",two:true" : ",two:false");
    for (int i = 0; i < 5; i++) {
        view_text(out, key[i]);
        view_number(out, value[i]);
    }
    view_text(out, ",ranges:[");
    for (int f = 0; f < v->frames; f += stride) view_write_extent(out, v, k, f);
    view_text(out, "]},");
}

/* what the page says about its own data */
static inline void view_write_note(view_buffer *out, const view *v, int stride, int bits) {
    char text[400];
    double reach = 0;
    int n;
    for (int m = 0; m < v->nmesh; m++)
        for (int c = 0; c < 3; c++)
            if (v->mesh[m].hi[c] - v->mesh[m].lo[c] > reach)
                reach = v->mesh[m].hi[c] - v->mesh[m].lo[c];
    n = snprintf(text, sizeof text, "Positions are stored in %d bits (steps of %.2g mm).", bits,
                 1e3 * reach / ((1 << bits) - 1));
    if (stride > 1 && n > 0)
        n += snprintf(text + n, sizeof text - (size_t)n,
                      " To stay below %d MB the page holds one frame in %d of the %d simulated.",
                      VIEW_MAX_BYTES / 1000000, stride, v->frames);
    if (v->held > 0 && n > 0)
        snprintf(text + n, sizeof text - (size_t)n,
                 " %ld values were not finite; those positions are the last finite ones.",
                 v->held);
    view_quote(out, text);
}

static inline void view_write_page(view_buffer *out, const view *v, int stride, int bits, int *q) {
    for (int i = 0; view_page_head[i] != NULL; i++) view_text(out, view_page_head[i]);
    view_text(out, "const D = {title:");
    view_quote(out, v->title);
    view_text(out, ",caption:");
    view_quote(out, v->caption);
    view_text(out, ",note:");
    view_write_note(out, v, stride, bits);
    view_text(out, v->up == 2 ? ",up:2,floor:" : ",up:1,floor:");
    if (isfinite(v->floor)) view_number(out, v->floor);
    else view_text(out, "null");
    view_text(out, ",camera:[");
    view_number(out, v->azimuth);
    view_text(out, ",");
    view_number(out, v->elevation);
    view_text(out, "],\ntimes:[");
    for (int f = 0; f < v->frames; f += stride) {
        view_number(out, v->t[f]);
        view_text(out, ",");
    }
    view_text(out, "],\nscalars:[");
    for (int k = 0; k < 2; k++) if (v->legend[k].name != NULL) view_write_legend(out, v, k, stride);
    view_text(out, "],\nmeshes:[");
    for (int m = 0; m < v->nmesh && !out->full; m++) {
        view_write_mesh(out, v, m, stride, bits, q);
        view_text(out, ",\n");
    }
    view_text(out, "]};\n");
    for (int i = 0; view_page_code[i] != NULL; i++) view_text(out, view_page_code[i]);
}

static inline const char *view_save(const view_buffer *b, const char *path) {
    FILE *file = fopen(path, "wb");
    if (file == NULL) return "the file cannot be opened for writing";
    size_t n = fwrite(b->p, 1, b->n, file);
    int bad = n != b->n;
    if (fclose(file) != 0) bad = 1;
    return bad ? "writing the file failed; what is there is incomplete" : NULL;
}

/* finds the finest storage that fits, and writes it */
static inline const char *view_finish(view *v, const char *path) {
    static const int stride[] = {1, 1, 1, 1, 2, 2, 3, 4, 6, 8, 12, 16, 24, 32, 64, 128};
    static const int bits[] = {16, 15, 14, 13, 14, 13, 13, 13, 13, 13, 12, 12, 12, 12, 12, 12};
    view_buffer out;
    size_t most = 0;
    const char *error = "the meshes do not fit into one page";
    for (int m = 0; m < v->nmesh; m++) {
        const view_body *b = &v->mesh[m];
        if (b->x.count == 0) return "a mesh was never put";
        if ((size_t)(b->nv > b->nf ? b->nv : b->nf) > most)
            most = (size_t)(b->nv > b->nf ? b->nv : b->nf);
    }
    if (v->legend[1].name != NULL && v->legend[0].name == NULL)
        return "scalar 1 was named without scalar 0";
    for (int k = 0; k < 2; k++) if (v->legend[k].name != NULL) view_range(v, k);
    int *q = (int *)malloc(12 * most * sizeof *q);
    memset(&out, 0, sizeof out);
    out.limit = VIEW_MAX_BYTES;
    for (size_t i = 0; q != NULL && i < sizeof stride / sizeof *stride; i++) {
        out.n = 0;
        out.full = 0;
        view_write_page(&out, v, stride[i], bits[i], q);
        if (out.failed || !out.full) break;
    }
    if (q == NULL || out.failed) error = "out of memory";
    else if (!out.full) error = view_save(&out, path);
    free(q);
    free(out.p);
    return error;
}

/* Writes the page and frees the view in every case. Returns NULL, or what went wrong as a
 * literal text; a file that was begun and could not be finished is left as it is. */
static inline const char *view_close(view *v, const char *path) {
    if (v == NULL) return "out of memory";
    const char *error = v->error;
    if (error == NULL && (v->frames == 0 || v->nmesh == 0)) error = "there is no frame to show";
    if (error == NULL) error = view_finish(v, path);
    view_free(v);
    return error;
}

#endif
