# browser.py - a headless Chromium in real time, through --remote-debugging-pipe: JSON ended by 0 on
# descriptors 3 and 4. For pages.py, live_page.py, picture.py.
#   b = Browser('900,640'); b.open('file:///...'); b.js('document.title'); b.close()
import base64, json, os, shutil, subprocess, tempfile


def found():
    names = ('chromium', 'chromium-browser', 'google-chrome')
    return next((name for name in names if shutil.which(name)), None)


class Browser:
    def __init__(self, size, one_core=False):
        self.profile = tempfile.mkdtemp()
        to_browser, self.out = os.pipe()
        self.into, to_us = os.pipe()

        def pipes():            # the browser reads 3 and writes 4
            a, b = os.dup(to_browser), os.dup(to_us)
            os.dup2(a, 3)
            os.dup2(b, 4)

        core = ['taskset', '-c', '0'] if one_core and shutil.which('taskset') else []
        self.process = subprocess.Popen(
            core + [found(), '--headless', '--no-sandbox', '--use-angle=swiftshader',
                    '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run',
                    '--disable-background-networking', '--disable-component-update',
                    '--disable-sync', '--remote-debugging-pipe', '--user-data-dir=' + self.profile,
                    '--window-size=' + size],
            preexec_fn=pipes, start_new_session=True, close_fds=False,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_browser)
        os.close(to_us)
        self.pending, self.number, self.tab, self.target = b'', 0, None, None

    def call(self, method, **params):
        self.number += 1
        message = {'id': self.number, 'method': method, 'params': params}
        if self.tab:
            message['sessionId'] = self.tab
        os.write(self.out, json.dumps(message).encode() + b'\0')
        while True:
            while b'\0' not in self.pending:
                data = os.read(self.into, 1 << 20)
                if not data:
                    raise RuntimeError('the browser ended')
                self.pending += data
            line, self.pending = self.pending.split(b'\0', 1)
            answer = json.loads(line)
            if answer.get('id') == self.number:
                if 'error' in answer:
                    raise RuntimeError(answer['error']['message'])
                return answer['result']

    # in a new tab; the one before is closed
    def open(self, url):
        old, self.tab = self.target, None
        self.target = self.call('Target.createTarget', url=url)['targetId']
        if old:
            self.call('Target.closeTarget', targetId=old)
        self.tab = self.call('Target.attachToTarget', targetId=self.target,
                             flatten=True)['sessionId']

    def go(self, url):          # in this tab
        self.call('Page.navigate', url=url)

    def js(self, text):
        answer = self.call('Runtime.evaluate', expression=text, returnByValue=True,
                           awaitPromise=True)
        return answer['result'].get('value')

    def mouse(self, kind, x, y):
        self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', buttons=1,
                  clickCount=1)

    # clip: x, y, width, height, scale; the PNG's bytes
    def shot(self, clip):
        return base64.b64decode(self.call('Page.captureScreenshot', format='png',
                                          clip=clip)['data'])

    def cpu(self):              # seconds of all its processes
        total = 0
        for name in filter(str.isdigit, os.listdir('/proc')):
            try:
                field = open('/proc/%s/stat' % name).read().rpartition(')')[2].split()
            except OSError:
                continue
            if int(field[3]) == self.process.pid:
                total += int(field[11]) + int(field[12])
        return total / os.sysconf('SC_CLK_TCK')

    def close(self):
        self.process.kill()
        self.process.wait()
        shutil.rmtree(self.profile, ignore_errors=True)
