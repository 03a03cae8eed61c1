#!/usr/bin/env python3
# live_page.py - drives examples/out/live.html in a headless Chromium, in real time, on one core.
#   make -C tests pages          or: python3 live_page.py PAGE HASH [STILL.png]
# The hash after 60 untouched steps is that of a native build (HASH); the cloth follows the mouse,
# the ball too; wind moves the cloth; no step fails; the page is at most 1 MB. 60 frames a second on
# one core are 16.7 ms of CPU a frame, all processes of the browser together: counted so, because a
# machine with other work has not a whole core to give.
# Last line: 'live_page.py: N passed, N failed, N skipped'.
import os, sys, time
from browser import Browser, found

page, want = sys.argv[1], sys.argv[2]
passed = failed = skipped = 0


def check(good, text):
    global passed, failed
    passed, failed = passed + bool(good), failed + (not good)
    if not good:
        print('live page: FAILED: ' + text)


def open_bound(good, text):
    global passed, skipped
    passed, skipped = passed + bool(good), skipped + (not good)
    print('  live page: %s%s' % ('' if good else 'open: ', text))


def end():
    print('live_page.py: %d passed, %d failed, %d skipped' % (passed, failed, skipped))
    sys.exit(failed > 0)


if not found():
    print('  live page: skipped: no chromium')
    skipped = 1
    end()

browser = Browser('640,480', one_core=True)
js, mouse = browser.js, browser.mouse
try:
    browser.open('file://' + os.path.abspath(page) + '#light')
    positions = '''(function () { const m = D.meshes[%d]; m.live(m.pos);
        return Array.from(m.pos); })()'''

    def moved(a, b):
        return max(abs(p - q) for p, q in zip(a, b))

    # where a point of the scene is on the screen
    at = '''(function () { const m = matrix(basis()), s = screen(m, %s);
        const r = document.getElementById('gl').getBoundingClientRect();
        return [r.left + s[0], r.top + s[1]]; })()'''

    for i in range(300):
        title = js('document.title') or ''
        if title.startswith(('ready', 'error')):
            break
        time.sleep(0.1)
    check(title == 'ready 60 steps ' + want, 'after 60 steps: %s, natively %s' % (title, want))
    time.sleep(2)               # the page has found how finely it can draw
    spent, drawn, made = browser.cpu(), js('D.live.drawn'), js('D.live.made')
    time.sleep(4)
    spent, drawn = browser.cpu() - spent, js('D.live.drawn') - drawn
    made = (js('D.live.made') - made) / max(drawn, 1)
    fps, cost, each = js('D.live.fps'), js('D.live.cost'), 1000 * spent / max(drawn, 1)
    print('  live page: %.0f frames a second, %.1f ms of CPU each in all processes, %.1f steps a '
          'frame, %.1f ms a step; software drawing on one core' % (fps, each, made, cost))
    open_bound(each <= 1000 / 60, '%.1f ms of CPU a frame (16.7: 60 frames a second)' % each)
    if len(sys.argv) > 3:
        clip = js('''(function () {
            const r = document.getElementById('stage').getBoundingClientRect();
            return { x: r.left + (r.width - 1.6 * r.height) / 2, y: r.top, width: 1.6 * r.height,
                     height: r.height, scale: 300 / r.height }; })()''')
        open(sys.argv[3], 'wb').write(browser.shot(clip))
    before = js(positions % 0)
    x, y = js(at % '[-0.35, 0.4, 0]')
    mouse('mousePressed', x, y)
    for i in range(15):
        mouse('mouseMoved', x - 8 * i, y)
        time.sleep(0.03)
    check(moved(before, js(positions % 0)) > 0.05, 'the cloth does not follow the mouse')
    mouse('mouseReleased', x - 112, y)
    # the ball, from where nothing is before it: its own centre as the page draws it
    before = js(positions % 1)
    x, y = js(at % '''(function () { const p = D.meshes[1];
        p.live(p.pos); const n = p.pos.length / 3; let c = [0, 0, 0];
        for (let i = 0; i < 3 * n; i++) c[i % 3] += p.pos[i] / n; return c; })()''')
    mouse('mousePressed', x, y)
    for i in range(15):
        mouse('mouseMoved', x + 6 * i, y)
        time.sleep(0.03)
    ball = moved(before, js(positions % 1))
    mouse('mouseReleased', x + 84, y)
    check(ball > 0.02, 'the ball does not follow the mouse (%.3f m)' % ball)
    js("document.getElementById('wind').value = 700; document.getElementById('wind').oninput()")
    before = js(positions % 0)
    time.sleep(1)
    check(moved(before, js(positions % 0)) > 0.02, 'wind does not move the cloth')
    check('failed' not in js("document.getElementById('clock').textContent"), 'a step failed')
    check(js('D.meshes[0].pos.every(Number.isFinite)'), 'a position is not finite')
    check(os.path.getsize(page) <= 1000000, 'the page is over 1 MB')
finally:
    browser.close()
end()
