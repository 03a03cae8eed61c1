/* live.js - the page around live.c: starts the kit, gives its arrays to the drawing of view_page.h,
 * and turns mouse, finger and sliders into calls. WASM holds the module in base64. */
window.onload = function () {
  const bytes = Uint8Array.from(atob(WASM), function (c) { return c.charCodeAt(0); });
  const host = { now: function () { return performance.now(); } };
  WebAssembly.instantiate(bytes, { host: host }).then(function (made) {
    run(made.instance.exports);
  }).catch(fail);
};

function run(kit) {
  const STEP = 1000 / 60, BUDGET = 10;          /* ms: of a step, most of it for the solver */
  let last = 0, owed = 0, steps = 0, failed = 0, cost = 0, frames = 0, since = 0, text = '';
  let touched = false, paused = false;
  if (kit._initialize) kit._initialize();
  if (kit.live_start()) throw new Error('the scene could not be made');
  const nv = kit.live_nv(), nf = kit.live_nf(), radius = kit.live_radius(), ball = sphere();
  function doubles(at, n) { return new Float64Array(kit.memory.buffer, at, n); }
  function ints(at, n) { return new Int32Array(kit.memory.buffer, at, n); }
  function hash() {
    return [1, 0].map(function (k) {
      return (kit.live_hash(k) >>> 0).toString(16).padStart(8, '0');
    }).join('');
  }
  /* the texture: X of each corner, which a sheet has one of at each vertex */
  const X = doubles(kit.live_X(), 6 * nf), tri = new Uint32Array(ints(kit.live_faces(), 3 * nf));
  const uv = new Int32Array(2 * nv), rv = new Uint32Array(nv);
  for (let i = 0; i < nv; i++) rv[i] = i;
  for (let i = 0; i < 3 * nf; i++)
    for (let k = 0; k < 2; k++) uv[2 * tri[i] + k] = Math.round(1000 * X[2 * i + k]);
  function sphere() {
    const x = [], t = [], A = 40, B = 20;
    for (let j = 0; j <= B; j++) for (let i = 0; i < A; i++) {
      const a = 2 * Math.PI * i / A, b = Math.PI * j / B;
      x.push(Math.sin(b) * Math.cos(a), Math.cos(b), -Math.sin(b) * Math.sin(a));
      const p = A * j + i, q = A * j + (i + 1) % A;
      if (j < B) t.push(p, p + A, q, q, p + A, q + A);
    }
    return { x: x, tri: new Uint32Array(t) };
  }
  const cloth = { name: 'cloth', cloth: true, tone: 0, nv: nv, nf: nf, tri: tri, s: [], frames: 1,
    levels: 1, lo: [-0.5, 0.2, -0.25], step: [1, 1.05, 0.5], nr: nv, rv: rv, rt: tri, ruv: uv,
    live: function (pos) { pos.set(doubles(kit.live_x(), 3 * nv)); } };
  const solid = { name: 'ball', cloth: false, tone: 0, nv: ball.x.length / 3, s: [], frames: 1,
    nf: ball.tri.length / 3, tri: ball.tri, levels: 1, lo: [-0.1, 0.45, -0.3], step: [0.4, 0.4, 0.6],
    live: function (pos) {
      const c = doubles(kit.live_center(), 3);
      for (let i = 0; i < pos.length; i++) pos[i] = c[i % 3] + (radius - 0.001) * ball.x[i];
    } };
  function point(ray) { doubles(kit.live_pointer(), 6).set(ray); }
  const live = {
    kit: kit,
    down: function (ray) {
      point(ray);
      touched = true;
      kit.live_set_budget(BUDGET);
      return kit.live_grab();
    },
    move: function (ray, closer) { point(ray); kit.live_drag(closer); },
    up: function () { kit.live_drop(); },
    /* as many steps as time has passed, two at most: a slow machine shows slow motion */
    frame: function (ms) {
      owed = Math.min(owed + (last ? ms - last : STEP), 2.2 * STEP);
      last = ms;
      frames++;
      live.drawn = (live.drawn || 0) + 1;
      if (ms - since > 500) {
        text = cost.toFixed(1) + ' ms a step, ' + Math.round(frames * 1000 / (ms - since)) +
          ' frames a second' + (failed ? ', ' + failed + ' steps failed' : '');
        live.fps = frames * 1000 / (ms - since);
        frames = 0;
        since = ms;
      }
      for (; owed > 0.9 * STEP && !paused; owed -= STEP) {
        const begin = performance.now();
        if (kit.live_step()) failed++;
        const spent = performance.now() - begin;
        cost = steps < 30 ? spent : cost + 0.05 * (spent - cost);
        live.cost = cost;
        live.made = (live.made || 0) + 1;
        if (++steps === 60 && !touched) live.hash = hash();
        if (steps === 60) document.title = 'ready 60 steps ' + (live.hash || 'touched');
      }
    },
    clock: function (e) { e.textContent = text; }
  };
  function slider(name, unit, lo, hi, at, act) {
    const label = document.createElement('label'), input = document.createElement('input');
    const out = document.createElement('span');
    input.type = 'range';
    input.min = 0; input.max = 1000;
    input.value = 1000 * at;
    input.id = name.toLowerCase();
    label.className = 'slider';
    label.append(name + ' ', input, out);
    function tidy(v) { return v < 10 ? v.toFixed(v < 1 ? 2 : 1) : Math.round(v / 10) * 10; }
    function show(value) { out.textContent = value + ' ' + unit; }
    input.oninput = function () {
      const v = lo > 0 ? lo * Math.pow(hi / lo, input.value / 1000) : lo + (hi - lo) * input.value / 1000;
      touched = true;
      kit.live_set_budget(BUDGET);
      act(v);
      show(tidy(v));
    };
    const start = lo > 0 ? lo * Math.pow(hi / lo, at) : lo + (hi - lo) * at;
    show(tidy(start));
    $('bar').insertBefore(label, $('clock'));
  }
  $('wire').parentNode.className = 'wide';
  ['back', 'play', 'next', 'scrub', 'speed'].forEach(function (id) {
    ($(id).closest('label') || $(id)).style.display = 'none';
  });
  slider('Wind', 'm/s', 0, 6, 0, function (v) { kit.live_wind(0.3 * v, 0, v); });
  slider('Stiffness', 'N/m', 30, 3000, 0.5, function (v) { kit.live_stiffness(v); });
  slider('Friction', '', 0, 1, 0.3, function (v) { kit.live_friction(v); });
  const again = document.createElement('button');
  again.textContent = 'Again';
  again.title = 'The start, untouched';
  again.onclick = function () {
    kit.live_start();
    steps = failed = 0;
    touched = false;
    delete live.hash;
  };
  $('bar').insertBefore(again, $('home'));
  window.D = { title: 'Live: pull it yourself', caption: '', note: '', tone: 1, up: 1, floor: 0,
    source: SOURCE, camera: [24, 8], times: [0], scalars: [], meshes: [cloth, solid], live: live };
  D.caption = nv + ' vertices and a ball, stepped 60 times a second by clothsim itself, ' +
    'compiled to WebAssembly; max_newton 4, and finished early where a step takes over ' + BUDGET +
    ' ms.';
  const script = document.createElement('script');
  script.textContent = $('rest').textContent;
  document.body.appendChild(script);
}
