#!/bin/bash
# pages.sh - opens every page of examples/out in a headless Chromium and looks at it.
#   make -C tests pages          or: tests/pages.sh [directory]
# Per page: the title becomes 'ready N frames'; pictures at three times (#t=SECONDS) differ
# pairwise (one picture where N is 1) and none is of one colour; the 2D canvas draws (#2d); no
# http in the file; at most 4 MB. At 1280 x 800, 390 x 844 and 844 x 390, light and dark: nothing
# scrolls sideways, no control is clipped, the picture has its part of the window, text has a
# contrast of 4.5 (WCAG AA). The same of the gallery, out/index.html, whose links must lead
# somewhere. Prints a line for each failure and 'pages: N passed, N failed'
# last. Skipped, with a printed line, where there is no Chromium.
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-$here/../examples/out}
browser=
for name in chromium chromium-browser google-chrome; do
    if command -v "$name" >/dev/null 2>&1; then browser=$name; break; fi
done
shopt -s nullglob
pages=()
for page in "$out"/*.html; do
    case $page in */index.html|*/live.html) ;; *) pages+=("$page") ;; esac
done
if [ -z "$browser" ]; then
    echo "pages: skipped, no chromium installed"
    echo "pages: 0 passed, 0 failed"
    exit 0
fi
if [ ${#pages[@]} -eq 0 ]; then
    echo "pages: skipped, no pages in $out (run: make -C examples show)"
    echo "pages: 0 passed, 0 failed"
    exit 0
fi
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
out=$(cd "$out" && pwd)

# a new empty profile for each run; software WebGL; no network services. A browser that hangs or
# dies is started again and given more time, and that is printed.
look() {
    local profile status=1 try
    for try in 1 2 3; do
        profile=$(mktemp -d "$work/profile.XXXXXX") || return 1
        timeout -k 5 $((60 * try)) "$browser" --headless --no-sandbox --use-angle=swiftshader \
            --enable-unsafe-swiftshader --disable-quic --no-first-run \
            --disable-background-networking --disable-component-update --disable-sync \
            --user-data-dir="$profile" --window-size=900,640 \
            "$@" >"$work/stdout" 2>"$work/log"
        status=$?
        rm -rf "$profile"
        [ $status -eq 0 ] && break
        echo "pages: the browser ended with status $status (try $try): ${*: -1}" >&2
    done
    cat "$work/stdout"
    return $status
}

# title_of URL: the page in $work/dom, its title in $title. A browser on a busy machine may spend
# its virtual time before the first picture is drawn: such a page is given more, and that is
# printed. An error of the page's own has another title and is not tried again.
title_of() {
    local budget
    for budget in 2000 10000 60000; do
        look --virtual-time-budget=$budget --dump-dom "$1" >"$work/dom"
        title=$(sed -n 's/.*<title>\([^<]*\)<\/title>.*/\1/p' "$work/dom" | head -n 1)
        [ "$title" = loading ] || break
        echo "pages: still loading after $budget ms of virtual time: $1" >&2
    done
}

# succeeds when the picture's middle holds more than 32 colours (the page's frame aside)
coloured() {
    python3 - "$1" <<'PY'
import struct, sys, zlib
data = open(sys.argv[1], 'rb').read()
at, idat = 8, b''
while at < len(data):
    size, kind = struct.unpack('>I4s', data[at:at + 8])
    body = data[at + 8:at + 8 + size]
    if kind == b'IHDR':
        w, h, depth, colour, _, _, lace = struct.unpack('>IIBBBBB', body)
    elif kind == b'IDAT':
        idat += body
    at += 12 + size
if depth != 8 or colour not in (2, 6) or lace:
    sys.exit('unexpected kind of PNG')
n = 3 if colour == 2 else 4
raw, row, seen = zlib.decompress(idat), bytearray(w * n), set()
for y in range(h):
    kind = raw[y * (w * n + 1)]
    line = bytearray(raw[y * (w * n + 1) + 1:(y + 1) * (w * n + 1)])
    for i in range(w * n):
        a = line[i - n] if i >= n else 0
        b = row[i]
        c = row[i - n] if i >= n else 0
        if kind == 1: p = a
        elif kind == 2: p = b
        elif kind == 3: p = (a + b) // 2
        elif kind == 4:
            q = a + b - c
            d = (abs(q - a), abs(q - b), abs(q - c))
            p = a if d[0] <= d[1] and d[0] <= d[2] else b if d[1] <= d[2] else c
        else: p = 0
        line[i] = (line[i] + p) & 255
    row = line
    if h // 4 < y < h // 2:
        seen.update(bytes(row[n * x:n * x + 3]) for x in range(w // 3, 2 * w // 3))
sys.exit(0 if len(seen) > 32 else 1)
PY
}

passed=0
failed=0
check() {                       # check STATUS TEXT
    if [ "$1" -eq 0 ]; then passed=$((passed + 1))
    else failed=$((failed + 1)); echo "pages: FAILED $name: $2"; fi
}
have_python=0
python3 -c 'import zlib' >/dev/null 2>&1 && have_python=1
[ $have_python -eq 1 ] || echo "pages: skipped the one-colour check, no python3"

# layout PAGE HASH: opens it in frames of six sizes and themes, and says what is wrong
mkdir -p "$work"
cat >"$work/probe.js" <<'JS'
'use strict';
const sizes = [[1280, 800], [390, 844], [844, 390]], themes = ['light', 'dark'], wrong = [];
let open = 0;
function rgba(text) { return text.match(/[0-9.]+/g).map(Number).concat(1).slice(0, 4); }
function luminance(c) {
    const v = c.slice(0, 3).map(x => (x /= 255) <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
    return 0.2126 * v[0] + 0.7152 * v[1] + 0.0722 * v[2];
}
function behind(win, e) {
    for (; e; e = e.parentElement) {
        const c = rgba(win.getComputedStyle(e).backgroundColor);
        if (c[3] > 0.9) return c;
    }
    return [255, 255, 255, 1];
}
function look(frame, label, gallery) {
    const win = frame.contentWindow, doc = frame.contentDocument, w = win.innerWidth;
    const h = win.innerHeight;
    if (doc.documentElement.scrollWidth > w) wrong.push(label + ': scrolls sideways');
    doc.querySelectorAll('h1, h2, p, b, a, button, select, input, label, span').forEach(e => {
        const r = e.getBoundingClientRect(), s = win.getComputedStyle(e), name = e.id || e.tagName;
        if (!r.width || !r.height || s.visibility === 'hidden') return;
        const out = r.left < -1 || r.right > w + 1 || (!gallery && (r.top < -1 || r.bottom > h + 1));
        if (out) wrong.push(label + ': ' + name + ' is outside');
        const own = Array.from(e.childNodes).some(n => n.nodeType === 3 && n.data.trim());
        const a = luminance(rgba(s.color)), b = luminance(behind(win, e));
        const k = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (own && k < 4.5) wrong.push(label + ': ' + name + ' has a contrast of ' + k.toFixed(2));
    });
    const stage = doc.getElementById('stage');
    if (stage && stage.getBoundingClientRect().height < 0.55 * h)
        wrong.push(label + ': the picture has ' + Math.round(stage.clientHeight / h * 100) + ' %');
    if (gallery && !doc.querySelectorAll('main a').length) wrong.push(label + ': no links');
}
function probe(url, hash, gallery) {
    sizes.forEach(size => themes.forEach(theme => {
        const f = document.createElement('iframe'), label = size.join('x') + ' ' + theme;
        open++;
        f.width = size[0];
        f.height = size[1];
        f.onload = () => setTimeout(() => {
            try { look(f, label, gallery); } catch (e) { wrong.push(label + ': ' + e.message); }
            if (--open === 0) document.title = wrong.length ? 'wrong: ' + wrong.join('; ') : 'layout ok';
        }, 700);
        f.src = url + hash + '&' + theme;
        document.body.appendChild(f);
    }));
}
JS
layout() {                      # layout URL HASH GALLERY
    { echo "<!DOCTYPE html><title>loading</title><body><script>"; cat "$work/probe.js"
      echo "probe('$1', '$2', $3);</script>"; } >"$work/probe.html"
    look --allow-file-access-from-files --virtual-time-budget=3000 --dump-dom \
        "file://$work/probe.html" >"$work/dom"
    title=$(sed -n 's/.*<title>\([^<]*\)<\/title>.*/\1/p' "$work/dom" | head -n 1)
    [ "$title" = 'layout ok' ]
    check $? "layout: $title"
}

name=index.html
[ -s "$out/index.html" ]
check $? 'there is no gallery'
layout "file://$out/index.html" '#x' true
for link in $(sed -n "s/^<a href='\([^'#]*\).*/\1/p" "$out/index.html"; \
              grep -o "src='[^']*'" "$out/index.html" | sed "s/src='//; s/'//"); do
    [ -s "$out/$link" ]
    check $? "$link is not there"
done

# one_page FILE: all checks of a page
one_page() {
    local url=file://$1 page=$1 count span part t shot budget shots=()
    layout "$url" '#2d&t=0.5&all' false
    title_of "$url"
    echo "$title" | grep -Eq '^ready [0-9]+ frames$'
    check $? "the title is '$title', not 'ready N frames'"
    count=$(echo "$title" | sed -n 's/^ready \([0-9]*\) frames$/\1/p')
    title_of "$url#2d"
    echo "$title" | grep -Eq '^ready [0-9]+ frames$'
    check $? "no 'ready N frames' on the 2D canvas"
    ! grep -qi http "$page"
    check $? "the page contains 'http'"
    [ "$(wc -c <"$page")" -le 4000000 ]
    check $? "the page is larger than 4 MB"
    span=$(sed -n 's/.* s of \([0-9.]*\) s .*/\1/p' "$work/dom" | head -n 1)
    span=${span:-1}
    for part in 0.03 0.4 0.83; do
        t=$(LC_ALL=C awk -v s="$span" -v p="$part" 'BEGIN { printf "%.4f", s * p }')
        shot=$work/shot$part.png
        for budget in 5000 20000; do
            rm -f "$shot"
            look --virtual-time-budget=$budget --screenshot="$shot" "$url#t=$t" >/dev/null
            [ -s "$shot" ] || continue
            [ $have_python -eq 0 ] || coloured "$shot" && break
        done
        [ -s "$shot" ]
        check $? "no picture at $t s"
        if [ -s "$shot" ] && [ $have_python -eq 1 ]; then
            coloured "$shot"
            check $? "the picture at $t s is of one colour"
        fi
        shots+=("$shot")
        [ "${count:-2}" -gt 1 ] || break
    done
    if [ ${#shots[@]} -eq 3 ]; then
        ! cmp -s "${shots[0]}" "${shots[1]}" && ! cmp -s "${shots[1]}" "${shots[2]}" &&
            ! cmp -s "${shots[0]}" "${shots[2]}"
        check $? "two of the three pictures are the same"
    fi
}

# two at a time, each with a directory, an output and a count of its own
for page in "${pages[@]}"; do
    name=${page##*/}
    mkdir -p "$work/$name"
    (
        cp "$work/probe.js" "$work/$name"
        work=$work/$name passed=0 failed=0
        one_page "$page"
        echo "$passed $failed" >"$work/count"
    ) >"$work/$name/lines" 2>&1 &
    while [ "$(jobs -rp | wc -l)" -ge 2 ]; do wait -n; done
done
wait
for page in "${pages[@]}"; do
    name=${page##*/}
    cat "$work/$name/lines"
    read -r n m <"$work/$name/count" || { n=0; m=1; echo "pages: FAILED $name: not looked at"; }
    passed=$((passed + n)) failed=$((failed + m))
done
name=live.html
live=0
if [ ! -s "$out/live.html" ]; then echo "pages: skipped the live page, it was not made"
else
    ! grep -qi http "$out/live.html"
    check $? "the page contains 'http'"
    layout "file://$out/live.html" '#2d' false
    if [ $have_python -eq 1 ]; then
        python3 "$here/live_page.py" "$out/live.html" "$(cat "$out/live.hash")" \
            "$out/live.png" >"$work/live"
        live=$?
        grep 'live page: ' "$work/live"
        line=$(tail -n 1 "$work/live")
        passed=$((passed + $(echo "$line" | sed 's/.*: \([0-9]*\) passed.*/\1/')))
        [ $live -eq 0 ]
        check $? "$line"
    fi
fi
echo "pages: $passed passed, $failed failed"
[ $failed -eq 0 ]
