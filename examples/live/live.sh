#!/bin/sh
# live.sh - makes out/live.html: the kit in WebAssembly, in one page. Run in examples/ by make show;
# needs clang with lld, wasi-libc and clang's runtime for wasm32 (Debian: clang lld wasi-libc
# libclang-rt-dev-wasm32); says so and makes nothing where one is missing.
# Beside it out/live.hash, what a native build of the same scene has after 60 steps, and its still.
# $1: the object that holds the implementation.
LC_ALL=C
export LC_ALL
cc=${X_CC:-cc}
flags='-std=c99 -ffp-contract=off -Wall -Wextra -pedantic'
rm -f out/live.html out/live.hash out/live.png
missing=
command -v clang >/dev/null 2>&1 || missing=clang
command -v wasm-ld >/dev/null 2>&1 || missing="$missing wasm-ld (lld)"
[ -z "$missing" ] && ! echo '#include <math.h>
int main(void) { return 0; }' | clang --target=wasm32-wasi -x c - -o out/live.probe >/dev/null 2>&1 &&
    missing='wasi-libc or the runtime of clang for wasm32'
rm -f out/live.probe
if [ -n "$missing" ]; then
    echo "  live page: skipped: needs $missing"
    exit 0
fi
clang --target=wasm32-wasi -mexec-model=reactor -O3 -msimd128 $flags -DCLOTH_NO_STDIO -DNDEBUG -I.. \
    live/live.c -o out/live.wasm -lm -Wl,--strip-all || exit 1
$cc $flags -O2 -I.. -I. live/live.c "$1" -o out/live_native -lm || exit 1
./out/live_native >out/live.hash 2>out/live.log || exit 1
$cc $flags -O1 -I. live/page.c -o out/live_page -lm || exit 1
./out/live_page out/live.wasm live/live.js live/live.c out/live.html || exit 1
echo "  live/live.c wrote out/live.html, $(($(wc -c <out/live.html) / 1000)) KB"
