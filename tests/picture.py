#!/usr/bin/python3
# picture.py - makes examples/moving.webp, the picture of README: three pages side by side, 2 s.
#   make -C examples show && python3 tests/picture.py       needs chromium and Pillow (python3-pil)
# Walk at half speed, drape, flag; animated WebP under 2 MB.
import io, os, sys
from PIL import Image
from browser import Browser

here = os.path.dirname(os.path.abspath(__file__))
out = os.path.join(here, '..', 'examples', 'out')
pages = [('16_walk', 0.0, 1.0), ('12_drape', 0.05, 1.45), ('03_flag', 1.0, 3.0)]
FRAMES, SIDE = 44, 320
strips = [Image.new('RGB', (SIDE * len(pages), SIDE)) for f in range(FRAMES)]
for i, (name, t0, t1) in enumerate(pages):
    browser = Browser('%d,%d' % (2 * SIDE, 2 * SIDE))
    try:
        browser.open('about:blank')         # a stage of the whole square: the window has a bar
        browser.call('Emulation.setDeviceMetricsOverride', width=2 * SIDE, height=2 * SIDE,
                     deviceScaleFactor=1, mobile=False)
        browser.go('file://%s/%s.html#light&t=%g' % (os.path.abspath(out), name, t0))
        while not (browser.js('document.title') or '').startswith('ready'):
            pass
        browser.js("""['header', 'footer', '#hint'].forEach(function (s) {
            document.querySelector(s).style.display = 'none'; });
            document.body.style.height = '%dpx'; ticks = function () {};
            $('ink').style.display = 'none'; 0""" % (2 * SIDE))
        browser.js('resize(); reset(); 0')
        for f in range(FRAMES):
            browser.js('now = %g; resize(); draw(); 0' % (t0 + (t1 - t0) * f / FRAMES))
            shot = Image.open(io.BytesIO(browser.shot(
                {'x': 0, 'y': 0, 'width': 2 * SIDE, 'height': 2 * SIDE, 'scale': 0.5})))
            strips[f].paste(shot.convert('RGB'), (SIDE * i, 0))
    finally:
        browser.close()
path = os.path.join(here, '..', 'examples', 'moving.webp')
strips[0].save(path, save_all=True, append_images=strips[1:], duration=45, loop=0, quality=62,
               method=4)
print(path, os.path.getsize(path) // 1000, 'KB')
strips[FRAMES // 2].save(os.path.join(here, 'out', 'moving.png'))
