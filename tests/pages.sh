#!/bin/sh
# pages.sh - the pages of examples/out in a headless Chromium: pages.py for all, live_page.py for
# what is more in the live one.
#   make -C tests pages          or: tests/pages.sh [directory]
# Two browsers at a time. Last line 'pages: N passed, N failed'; skipped, with a sentence, where
# there is no Chromium or no python3.
LC_ALL=C
export LC_ALL
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-$here/../examples/out}
work=$(mktemp -d) || exit 1
trap 'rm -rf "$work"' EXIT
need=
python3 -c 'import zlib' >/dev/null 2>&1 || need='no python3 installed'
(cd "$here" && python3 -c 'import sys, browser; sys.exit(not browser.found())') >/dev/null 2>&1 ||
    need=${need:-no chromium installed}
[ -s "$out/index.html" ] || need="no pages in $out (run: make -C examples pages)"
if [ -n "$need" ]; then
    echo "pages: skipped: $need"
    echo "pages: 0 passed, 0 failed"
    exit 0
fi
# ended without a count: one failure
for half in 0/2 1/2; do
    { python3 "$here/pages.py" "$out" $half 2>&1 || echo 'pages: that half failed'; } \
        >"$work/${half%/2}" &
done
wait
if [ ! -s "$out/live.html" ]; then echo "pages: skipped: the live page, it was not made"
else
    python3 "$here/live_page.py" "$out/live.html" "$(cat "$out/live.hash")" >"$work/live" 2>&1 ||
        echo 'pages: that half failed' >>"$work/live"
fi
cat "$work"/* | awk '
    /^pages: [0-9]+ passed|^live_page.py: / { p += $2; f += $4; counts++; next }
    /^pages: that half failed/ { bad++; next }
    { print }
    END { if (bad && !f) f = bad; print "pages: " p + 0 " passed, " f + 0 " failed"; exit f > 0 }'
