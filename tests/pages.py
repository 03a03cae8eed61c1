#!/usr/bin/env python3
# pages.py - opens every page of examples/out in one headless Chromium and looks at it.
#   make -C tests pages          or: sh pages.sh [directory [0/2]]         0/2: every other page
# Per page: the title becomes 'ready N frames' with WebGL and with the 2D canvas (#2d); pictures at
# three times (#t=SECONDS) differ pairwise (one where N is 1) and none is of one colour; no http in
# the file; at most 4 MB. At 1280 x 800, 390 x 844 and 844 x 390, light and dark: nothing scrolls
# sideways, no control is clipped, the picture has its part of the window, text has a contrast of
# 4.5 (WCAG AA); a touch screen is told to pinch. The same of the gallery, out/index.html, whose
# links and pictures must be there. A line for each failure, last 'pages: N passed, N failed'.
import base64, os, re, struct, sys, time, zlib
from browser import Browser

SIZES = [(1280, 800), (390, 844), (844, 390)]
LOOK = r'''(function (gallery) {
    const wrong = [], w = innerWidth, h = innerHeight;
    function rgba(text) { return text.match(/[0-9.]+/g).map(Number).concat(1).slice(0, 4); }
    function luminance(c) {
        const v = c.slice(0, 3).map(x => (x /= 255) <= 0.04045 ? x / 12.92
                                                              : ((x + 0.055) / 1.055) ** 2.4);
        return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2];
    }
    function behind(e) {
        for (; e; e = e.parentElement) {
            const c = rgba(getComputedStyle(e).backgroundColor);
            if (c[3] > 0.9) return c;
        }
        return [255, 255, 255, 1];
    }
    if (document.documentElement.scrollWidth > w) wrong.push('scrolls sideways');
    document.querySelectorAll('h1, h2, p, b, a, button, select, input, label, span, code').forEach(
        e => {
        const r = e.getBoundingClientRect(), s = getComputedStyle(e), name = e.id || e.tagName;
        if (!r.width || !r.height || s.visibility === 'hidden') return;
        if (r.left < -1 || r.right > w + 1 || (!gallery && (r.top < -1 || r.bottom > h + 1)))
            wrong.push(name + ' is outside');
        const own = Array.from(e.childNodes).some(n => n.nodeType === 3 && n.data.trim());
        const a = luminance(rgba(s.color)), b = luminance(behind(e));
        const k = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (own && k < 4.5) wrong.push(name + ' has a contrast of ' + k.toFixed(2));
    });
    const stage = document.getElementById('stage'), hint = document.getElementById('hint');
    if (stage && stage.getBoundingClientRect().height < 0.55 * h)
        wrong.push('the picture has ' + Math.round(stage.clientHeight / h * 100) + ' %');
    if (gallery && !document.querySelectorAll('main a').length) wrong.push('no links');
    if (matchMedia('(pointer: coarse)').matches && hint && /scroll/.test(hint.textContent))
        wrong.push('the hint is for a mouse: ' + hint.textContent);
    return wrong.join('; ');
})(GALLERY)'''
passed = failed = 0


def check(good, name, text):
    global passed, failed
    passed, failed = passed + bool(good), failed + (not good)
    if not good:
        print('pages: FAILED %s: %s' % (name, text), flush=True)


# distinct colours of a PNG as the browser writes it
def colours(data):
    at, idat = 8, b''
    while at < len(data):
        size, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + size]
        if kind == b'IHDR':
            w, h, depth, colour = struct.unpack('>IIBB', body[:10])
        elif kind == b'IDAT':
            idat += body
        at += 12 + size
    n = 3 if colour == 2 else 4
    raw, row, seen = zlib.decompress(idat), bytearray(w * n), set()
    for y in range(h):
        kind, start = raw[y * (w * n + 1)], y * (w * n + 1) + 1
        line = bytearray(raw[start:start + w * n])
        for i in range(w * n):
            a, b, c = (line[i - n], row[i], row[i - n]) if i >= n else (0, row[i], 0)
            q = a + b - c
            d = abs(q - a), abs(q - b), abs(q - c)
            paeth = a if d[0] <= d[1] and d[0] <= d[2] else b if d[1] <= d[2] else c
            line[i] = line[i] + (0, a, b, (a + b) // 2, paeth)[kind] & 255
        seen.update(bytes(line[n * x:n * x + 3]) for x in range(w))
        row = line
    return len(seen)


# what a page's title has become; a busy machine is given a minute
def title(browser):
    for i in range(600):
        text = browser.js('document.title') or ''
        if text.startswith(('ready', 'error', 'clothsim')):
            break
        time.sleep(0.1)
    return text


# two frames have been drawn since
def drawn(browser):
    browser.js('new Promise(f => requestAnimationFrame(() => requestAnimationFrame(f)))')


def window(browser, size, theme):
    browser.call('Emulation.setDeviceMetricsOverride', width=size[0], height=size[1],
                 deviceScaleFactor=1, mobile=min(size) < 500)
    browser.call('Emulation.setTouchEmulationEnabled', enabled=min(size) < 500)
    browser.call('Emulation.setEmulatedMedia',
                 features=[{'name': 'prefers-color-scheme', 'value': theme}])


# url + hash at three sizes in both themes; a size of another kind of pointer is a new page. A page
# that has drawn once need not draw for each.
def layout(browser, name, url, want, gallery):
    for size in SIZES:
        for theme in 'light', 'dark':
            if theme == 'light' and size != SIZES[2]:
                browser.open('about:blank')
                window(browser, size, theme)
                browser.go(url + '&light')
                text = title(browser)
                check(re.match(want, text), name, "%s: the title is '%s'" % (url[-20:], text))
                browser.js('draw = function () {}; if (window.D && D.live) D.live.frame = draw; 0')
            elif not gallery:
                browser.js("document.getElementById('theme').click(); 0")
            window(browser, size, theme)
            drawn(browser)
            here = browser.js("document.documentElement.dataset.theme || ''")
            check(gallery or here == theme, name, 'the theme is %s, not %s' % (here, theme))
            wrong = browser.js(LOOK.replace('GALLERY', 'true' if gallery else 'false'))
            check(wrong == '', name, 'layout %d x %d %s: %s' % (size + (theme, wrong)))


def gallery(browser, out):
    path = os.path.join(out, 'index.html')
    if not os.path.exists(path):
        check(False, 'index.html', 'there is no gallery')
        return
    layout(browser, 'index.html', 'file://' + path + '#x', 'clothsim', True)
    text = open(path).read()
    links = re.findall("<a href='([^'#]*)", text) + re.findall("src='([^']*)'", text)
    check(len(links) > 1, 'index.html', 'it has no links')
    for link in links:
        check(os.path.getsize(os.path.join(out, link)) if os.path.exists(os.path.join(out, link))
              else 0, 'index.html', link + ' is not there')


def page(browser, out, name):
    path, shots = os.path.join(out, name), []
    url, text = 'file://' + path, open(path).read()
    check('http' not in text.lower(), name, "it contains 'http'")
    check(os.path.getsize(path) <= 4000000, name, 'it is larger than 4 MB')
    if name == 'live.html':
        layout(browser, name, url + '#x&all', 'ready 60 steps', False)
        return
    layout(browser, name, url + '#2d&t=0.5&all', 'ready [0-9]+ frames$', False)
    clock = browser.js("document.getElementById('clock').textContent")
    span = re.search(r's of ([0-9.]+) s ', clock)
    times = [part * float(span.group(1) if span else 1) for part in (0.03, 0.4, 0.83)]
    browser.open('about:blank')
    window(browser, (900, 640), 'light')
    browser.go('%s#t=%.4f' % (url, times[0]))
    ready = title(browser)
    for at in times[:1] if ready == 'ready 1 frames' else times:
        if at != times[0]:
            browser.js('now = %.4f; draw(); 0' % at)
        drawn(browser)
        shots.append(browser.shot({'x': 300, 'y': 160, 'width': 300, 'height': 260, 'scale': 0.5}))
        check(colours(shots[-1]) > 32, name, 'the picture at %.3f s is of one colour' % at)
    check(re.match('ready [0-9]+ frames$', ready), name, "with WebGL the title is '%s'" % ready)
    check(len(set(shots)) == len(shots), name, 'two of the pictures are the same')


out = os.path.abspath(sys.argv[1])
part, parts = (int(n) for n in sys.argv[2].split('/')) if len(sys.argv) > 2 else (0, 1)
names = sorted(n for n in os.listdir(out) if n.endswith('.html') and n != 'index.html')
browser = Browser('900,640')
try:
    if part == 0:
        gallery(browser, out)
    for each in names[part::parts]:
        page(browser, out, each)
finally:
    browser.close()
print('pages: %d passed, %d failed' % (passed, failed))
sys.exit(failed > 0)
