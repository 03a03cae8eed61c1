#!/bin/sh
# platforms.sh - one program, every compiler and machine that is installed, the same bits.
#   make -C tests platforms          or, in tests/: sh platforms.sh [NAME ...]
# Builds platform_scene.c with each, runs it (emulated where need be) and prints a table of hashes.
# Rows of one class must agree: 'plain' is doubles with -ffp-contract=off, 'fma' the same with AVX2
# and FMA, whose loops sum in another order. A refusal that is promised (x87) is a row too. What is
# not installed is skipped with a sentence. Last line: 'platforms.sh: N passed, N failed, N skipped'.
LC_ALL=C
export LC_ALL
export WINEDEBUG=-all
PATH=$PATH:/usr/lib/wine
out=out/platforms
jobs=${JOBS:-2}
flags='-ffp-contract=off -Wall -Wextra -pedantic -Wconversion -Wshadow -Wdouble-promotion -Werror'
cross='-std=c99 -O2 -static'

# row NAME CLASS RUNNER COMPILER FLAGS...: what a row is; RUNNER - runs it as it is
rows() {
    cat <<ROWS
gcc             plain  -             gcc -std=c99 -O2
gcc-O0          plain  -             gcc -std=c99 -O0
g++             plain  -             g++ -x c++ -std=c++11 -O2
clang           plain  -             clang -std=c99 -O2
clang-no-simd   plain  -             clang -std=c99 -O1 -DCLOTH_NO_SIMD
tcc             plain  -             tcc -std=c99
musl            plain  -             musl-gcc $cross
x86-32-sse2     plain  -             i686-linux-gnu-gcc $cross -msse2 -mfpmath=sse
x86-32-multilib plain  -             gcc -m32 -std=c99 -O2 -msse2 -mfpmath=sse
mingw-wine      plain  wine64        x86_64-w64-mingw32-gcc -std=c99 -O2 -DPLATFORM_WINDOWS_FIRST
aarch64         plain  qemu-aarch64  aarch64-linux-gnu-gcc $cross
riscv64         plain  qemu-riscv64  riscv64-linux-gnu-gcc $cross
s390x           plain  qemu-s390x    s390x-linux-gnu-gcc -std=gnu99 -O2 -static
wasm32          plain  node          clang --target=wasm32-wasi -std=c99 -O2
gcc-v3          fma    -             gcc -std=c99 -O3 -march=x86-64-v3
clang-v3        fma    -             clang -std=c99 -O3 -march=x86-64-v3
x86-32-x87      refuse -             i686-linux-gnu-gcc $cross -mno-sse -mfpmath=387
x86-32-x87-m32  refuse -             gcc -m32 -std=c99 -mno-sse -mfpmath=387
ROWS
}

have() { command -v "$1" >/dev/null 2>&1; }

# start RUNNER EXE
start() {
    case $1 in
    -) "./$2" ;;
    node) node --no-warnings $out/wasi.js "$2" ;;
    *) "$1" "$2" ;;
    esac
}

# row NAME CLASS RUNNER COMPILER...: its verdict in $out/NAME.row: 'ok|bad|skip<tab>text'
row() {
    name=$1 class=$2 runner=$3
    shift 3
    exe=$out/$name
    case $name in mingw*) exe=$exe.exe ;; wasm*) exe=$exe.wasm ;; esac
    say() { printf '%s\t%s\n' "$1" "$2" >$out/$name.row; }
    have "$1" || { say skip "no $1"; return; }
    [ "$runner" = - ] || have "$runner" || { say skip "no $runner to run it with"; return; }
    probe=$out/probe-$name${exe#"$out/$name"}
    if ! "$@" $out/probe.c -o "$probe" -lm >$out/$name.log 2>&1; then
        say skip "$* does not compile a line that needs libc"
        return
    fi
    if ! start "$runner" "$probe" >>$out/$name.log 2>&1; then
        case $class in refuse) ;; *) say skip "what $1 makes does not run here"; return ;; esac
    fi
    begin=$(date +%s)
    # tcc knows few warnings, MinGW's own headers are not pedantic, C++ is for C++'s users
    case $name in
    tcc|g++) "$@" -ffp-contract=off -I.. platform_scene.c -o "$exe" -lm >$out/$name.log 2>&1 ;;
    *) "$@" $flags -I.. platform_scene.c -o "$exe" -lm >$out/$name.log 2>&1 ;;
    esac
    built=$?
    if [ $class = refuse ]; then
        if [ $built != 0 ] && grep -q 'error.*-mfpmath=sse' $out/$name.log; then say ok refused
        else say bad 'not refused: x87 rounds otherwise'
        fi
        return
    fi
    [ $built = 0 ] || { say bad "does not build: $(grep -m 1 error $out/$name.log)"; return; }
    middle=$(date +%s)
    start "$runner" "$exe" >$out/$name.said 2>&1 || { say bad "fails: $(cat $out/$name.said)"; return; }
    tr -d '\r' <$out/$name.said | sed 's/^platform_scene //; s/ pairs 0$//' >$out/$name.hash
    say ok "$(cat $out/$name.hash)	$((middle - begin)) s	$(($(date +%s) - middle)) s"
}

if [ "${1:-}" = --row ]; then shift; row "$@"; exit 0; fi
rm -rf $out
mkdir -p $out || exit 2

cat >$out/probe.c <<'C'
#include <math.h>
#include <stdio.h>
int main(void) { printf("%g\n", sqrt(2.0)); return 0; }
C
cat >$out/wasi.js <<'JS'
const { WASI } = require('wasi'), fs = require('fs');
const wasi = new WASI({ version: 'preview1', args: [] });
WebAssembly.instantiate(fs.readFileSync(process.argv[2]),
                        { wasi_snapshot_preview1: wasi.wasiImport })
    .then(m => process.exit(wasi.start(m.instance)));
JS

start_time=$(date +%s)
if [ $# -gt 0 ]; then for name in "$@"; do rows | grep "^$name "; done; else rows; fi |
    sed 's/  */ /g' >$out/rows
xargs -P "$jobs" -L 1 sh platforms.sh --row <$out/rows

passed=0 failed=0 skipped=0
printf '  %-16s %-16s %-16s %-16s %6s %6s\n' platform contact bdf2 leapfrog built ran
while read -r name class rest; do
    verdict=bad text='no verdict' built='' ran='' why=''
    IFS='	' read -r verdict text built ran <"$out/$name.row"
    [ $class = refuse ] || [ "$verdict" != ok ] || [ -f $out/$class ] || echo "$text" >$out/$class
    case $verdict in
    skip)
        skipped=$((skipped + 1))
        echo "  skipped: $name: $text" >>$out/skips
        continue ;;
    bad) why=' FAILED' ;;
    ok)
        [ $class = refuse ] || [ "$text" = "$(cat $out/$class)" ] ||
            why=" FAILED: not the bits of the first row of class $class" ;;
    esac
    if [ -z "$why" ]; then passed=$((passed + 1)); else failed=$((failed + 1)); fi
    if [ -n "$ran" ]; then
        printf '  %-16s %s %s %s %6s %6s%s\n' "$name" $text "$built" "$ran" "$why"
    else printf '  %-16s %s%s\n' "$name" "$text" "$why"
    fi
done <$out/rows
# README shows the hash of the swing, which contact does not touch
if [ -f $out/plain ]; then
    if grep -q "$(cut -d' ' -f2 $out/plain)" ../README.md; then passed=$((passed + 1))
    else failed=$((failed + 1)); echo "  FAILED: README has another hash than bdf2's"
    fi
fi
[ -f $out/skips ] && cat $out/skips
[ $((passed + failed)) -gt 0 ] || { echo '  FAILED: no compiler at all'; failed=1; }
echo "platforms.sh: $passed passed, $failed failed, $skipped skipped ($(($(date +%s) - start_time)) s)"
[ $failed -eq 0 ]
