#!/usr/bin/env python3
# live_page.py - drives examples/out/live.html in a headless Chromium, in real time, on one core.
#   make -C tests pages          or: python3 live_page.py PAGE HASH [STILL.png]
# The hash after 60 untouched steps is that of a native build (HASH); the cloth follows the mouse,
# the ball too; wind moves the cloth; no step fails; the page is at most 1 MB. 60 frames a second on
# one core are 16.7 ms of CPU a frame, all processes of the browser together: counted so, because a
# machine with other work has not a whole core to give.
# Talks to the browser through --remote-debugging-pipe: JSON ended by 0 on descriptors 3 and 4.
# Last line: 'live_page.py: N passed, N failed, N skipped'.
import base64, json, os, shutil, subprocess, sys, tempfile, time

page, want = sys.argv[1], sys.argv[2]
browser = next((b for b in ('chromium', 'chromium-browser', 'google-chrome') if shutil.which(b)), None)
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


if not browser:
    print('  live page: skipped: no chromium')
    skipped = 1
    end()

profile = tempfile.mkdtemp()
to_browser, from_us = os.pipe()
from_browser, to_us = os.pipe()


def pipes():                    # the browser reads 3 and writes 4
    a, b = os.dup(to_browser), os.dup(to_us)
    os.dup2(a, 3)
    os.dup2(b, 4)


one_core = ['taskset', '-c', '0'] if shutil.which('taskset') else []
process = subprocess.Popen(
    one_core + [browser, '--headless', '--no-sandbox', '--use-angle=swiftshader', '--disable-quic',
                '--enable-unsafe-swiftshader', '--no-first-run', '--disable-background-networking',
                '--disable-component-update', '--disable-sync', '--remote-debugging-pipe',
                '--user-data-dir=' + profile, '--window-size=640,480'],
    preexec_fn=pipes, start_new_session=True, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
os.close(to_browser)
os.close(to_us)
pending, number = b'', 0


def call(method, session=None, **params):
    global pending, number
    number += 1
    message = {'id': number, 'method': method, 'params': params}
    if session:
        message['sessionId'] = session
    os.write(from_us, json.dumps(message).encode() + b'\0')
    while True:
        while b'\0' not in pending:
            data = os.read(from_browser, 1 << 20)
            if not data:
                raise RuntimeError('the browser ended')
            pending += data
        line, pending = pending.split(b'\0', 1)
        answer = json.loads(line)
        if answer.get('id') == number:
            if 'error' in answer:
                raise RuntimeError(answer['error']['message'])
            return answer['result']


def cpu():                      # seconds of all processes of the browser
    sum = 0
    for name in filter(str.isdigit, os.listdir('/proc')):
        try:
            field = open('/proc/%s/stat' % name).read().rpartition(')')[2].split()
        except OSError:
            continue
        if int(field[3]) == process.pid:
            sum += int(field[11]) + int(field[12])
    return sum / os.sysconf('SC_CLK_TCK')


try:
    target = call('Target.createTarget', url='file://' + os.path.abspath(page) + '#light')
    tab = call('Target.attachToTarget', targetId=target['targetId'], flatten=True)['sessionId']

    def js(text):
        return call('Runtime.evaluate', tab, expression=text, returnByValue=True)['result'].get('value')

    def mouse(kind, x, y):
        call('Input.dispatchMouseEvent', tab, type=kind, x=x, y=y, button='left', buttons=1,
             clickCount=1)

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
    spent, drawn = cpu(), js('D.live.drawn')
    time.sleep(4)
    spent, drawn = cpu() - spent, js('D.live.drawn') - drawn
    fps, cost, each = js('D.live.fps'), js('D.live.cost'), 1000 * spent / max(drawn, 1)
    print('  live page: %.0f frames a second, %.1f ms of CPU each in all processes, %.1f ms a step; '
          'software drawing on one core' % (fps, each, cost))
    open_bound(each <= 1000 / 60, '%.1f ms of CPU a frame (16.7: 60 frames a second)' % each)
    if len(sys.argv) > 3:
        shot = call('Page.captureScreenshot', tab, format='png', clip=js('''(function () {
            const r = document.getElementById('stage').getBoundingClientRect(), k = 480 / r.height / 1.6;
            return { x: r.left + (r.width - 1.6 * r.height) / 2, y: r.top, width: 1.6 * r.height,
                     height: r.height, scale: k }; })()'''))
        open(sys.argv[3], 'wb').write(base64.b64decode(shot['data']))
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
    process.kill()
    process.wait()
    shutil.rmtree(profile, ignore_errors=True)
end()
