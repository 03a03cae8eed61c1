#!/bin/sh
# checks.sh - what is checked of the text and the object code rather than of the numbers.
#   sh checks.sh text        contents and banners, width, ASCII, length of functions, cited tests
#   sh checks.sh comments    every program starts with its compile line
#   sh checks.sh commands    those lines, run as they stand
#   sh checks.sh names       only cloth names leave the object, only CLOTH macros the header
#                            no word is one that windows.h or complex.h takes; tcc compiles it
#   sh checks.sh units       declarations and implementation in two units, C and C++ mixed; the
#                            object's bytes; seconds to compile
#   sh checks.sh compile     compile_only.c: compilers x standards x orders x configurations
#   sh checks.sh programs    every test and example compiled as C99, nothing run; [gcc or clang]
#   sh checks.sh quickstart  [1.1] of clothsim.h = examples/01_hang.c, [1.1] of clothsim_collide.h
#                            = examples/12_drape.c = README, of clothsim_grad.h compiles;
#                            README's other blocks and commands compile and run as they stand
#   sh checks.sh judges      garments on bodies that move, by the programs of ../shared/judge:
#                            two hours; ONLY=NAME for one of them, STEPS=N to cut all short,
#                            STARTS=N: each from N starts a nanometre apart, for figures of one
#                            walk are chance
#   sh checks.sh yardstick DIR          builds the prototype that speed is compared with
#   sh checks.sh fuzz SECONDS FILES     runs each libFuzzer entry
# FULL=1: what compile, units and quickstart leave to the long tier is done too.
# Run from tests/. Each prints 'checks.sh NAME: N passed, N failed, N skipped (S s)' last.
LC_ALL=C
export LC_ALL

check=$1
shift
out=out/checks/$check
# a run that was stopped may still write while the next one reads: each has files of its own
if [ "$check" = judges ]; then
    out=$out.$$
    trap 'rm -rf "$out"' EXIT
fi
mkdir -p "$out"
passed=0 failed=0 skipped=0

ok() { passed=$((passed + 1)); }
bad() { failed=$((failed + 1)); echo "  FAILED: $*"; }
# a bound that does not hold yet: as OPEN in test.h
open() { skipped=$((skipped + 1)); echo "  $1: open: $2"; }
skip() { skipped=$((skipped + 1)); echo "  skipped: $*"; }
# says what: must WHAT COMMAND... counts a test and shows the output of one that fails
must() {
    what=$1
    shift
    if "$@" >"$out/said" 2>&1; then ok; else bad "$what"; sed 's/^/    /' "$out/said"; fi
}
# a list of offenders must be empty
none() { if [ -s "$2" ]; then bad "$1"; sed 's/^/    /' "$2"; else ok; fi; }
have() { command -v "$1" >/dev/null 2>&1; }
full() { [ "${FULL:-}" = 1 ]; }
# CPU seconds of the children so far, in $now; a subshell would only see its own
cpu() {
    times >"$out/times"
    now=$(awk 'NR == 2 { gsub(/[ms]/, " "); print $1 * 60 + $2 + $3 * 60 + $4 }' "$out/times")
}

cc=${X_CC:-cc}
std=${X_STD:--std=c99}
lang=
[ -n "${X_CXX:-}" ] && lang='-x c++'
base="-O2 -ffp-contract=off -I.."
warn='-Wall -Wextra -pedantic -Wconversion -Wshadow -Wdouble-promotion -Wundef -Werror'
warn_c='-Wstrict-prototypes -Wmissing-prototypes -Wc++-compat'
headers=
for h in clothsim.h clothsim_collide.h clothsim_grad.h; do
    [ -f ../$h ] && headers="$headers $h"
done
programs=$(ls test_*.c platform_scene.c validate/*.c stability/*.c bench/*.c 2>/dev/null)
examples=$(ls ../examples/[0-9][0-9]_*.c ../examples/*/[0-9][0-9]_*.c 2>/dev/null)

unit() {        # unit FILE: one .c file with every implementation
    echo '#define CLOTHSIM_IMPLEMENTATION' >"$1"
    for h in $headers; do echo "#include \"$h\"" >>"$1"; done
}

run_text() {
    files=$(ls ../*.h *.[ch] */*.[ch] *.awk ../examples/*.[ch] ../examples/*/*.[ch] 2>/dev/null |
            grep -v '^out/\|/out/')
    for h in $headers; do
        must "contents of $h" awk -v check=contents -f check_text.awk ../$h
        case $h in
        clothsim.h) most=10500 ;;
        clothsim_collide.h) most=6500 ;;
        *) most=4000 ;;
        esac
        lines=$(wc -l <../$h)
        if [ $h = clothsim_grad.h ]; then must "$h has $lines lines" test "$lines" -le $most
        elif [ "$lines" -gt $most ]; then open lines "$h has $lines ($most)"
        else ok; fi
    done
    must 'contents of kdsm.h' awk -v check=contents -f check_text.awk ../examples/kdsm/kdsm.h
    must 'the lines' awk -v check=lines -f check_text.awk $files
    must 'the length of functions' awk -v check=functions -f check_text.awk \
        $(printf '%s\n' $files | grep '\.h$')
    cited=
    for h in ../README.md ../examples/COURSE.md ACCURACY.md SPEED.md; do cited="$cited $h"; done
    for h in $headers; do cited="$cited ../$h"; done
    must 'cited tests' awk -v check=cites -f check_text.awk $cited
    must "README has $(wc -c <../README.md) bytes" test "$(wc -c <../README.md)" -le 9216
    for link in $(grep -o '](\([^)]*\))' ../README.md | sed 's/](//; s/)//'); do
        must "README's link $link" test -s "../$link"
    done
    version=$(sed -n '1s/.*version //p' ../clothsim.h)
    for line in "clothsim $version:" "#define CLOTH_VERSION_MINOR $(echo "$version" | cut -d. -f2)" \
            " \* $version  "; do
        must "version $version: $line" grep -q "$line" ../README.md ../clothsim.h
    done
    for h in $headers; do must "the version of $h" grep -q "version $version" ../$h; done
    grep -nE 'cloth[i]?_[a-zA-Z0-9_]*(_t\b|__)' $files >"$out/names" /dev/null
    none 'names that end in _t or hold __' "$out/names"
}

# The line must name its file, the standard and the library, and hold the implementation once.
run_comments() {
    for file in $programs $examples; do
        line=$(sh suite.sh line "$file")
        name=$file
        case $file in ../examples/*) name=${file#../examples/} ;; esac
        need='-std=c99 -ffp-contract=off -lm'
        if grep -q 'clothsim.*\.h"' "$file" && ! sh suite.sh has_implementation "$file"; then
            need="$need -DCLOTHSIM_IMPLEMENTATION"
        fi
        lacks=
        for word in $name $need; do
            case " $line " in *" $word "*) ;; *) lacks="$lacks $word" ;; esac
        done
        if [ -z "$lacks" ]; then ok
        elif [ -z "$line" ]; then bad "$file: its first comment holds no line 'cc ... $name ... -lm'"
        else bad "$file: its compile line lacks$lacks"
        fi
    done
}

run_commands() {
    for file in $programs $examples; do
        dir=.
        case $file in ../examples/*) dir=../examples ;; esac
        line=$(sh suite.sh line "$file" | sed 's/ -o  *[^ ]*//')
        exe=$(pwd)/$out/program
        must "$file: $line" sh -c "cd $dir && $line -o '$exe'"
    done
}

run_names() {
    if [ -z "$lang" ]; then
        kit_warn=$warn
        compile_words
        # the strictest about what is constant
        ! have tcc || must 'the kit compiles with tcc' tcc -std=c99 -I.. -c compile_only.c \
            $(orders | head -n 1) -o "$out/one.o"
    fi
    if ! have nm || [ "$(uname -s)" != Linux ]; then
        skip 'names of the object: needs nm and ELF'
    else
        unit "$out/kit.c"
        # -fno-pic: tables of constants stay out of the writable .data.rel.ro; -O0: all functions stay
        must 'the kit compiles' $cc $std -O0 -I.. -fno-pic $lang -c "$out/kit.c" -o "$out/kit.o"
        # weak ones are what C++ makes of pow(double, int)
        nm -g --defined-only "$out/kit.o" |
            awk '$2 != "W" && $3 !~ /^cloth_/ { print $3 }' >"$out/global"
        none 'global names that do not start with cloth_' "$out/global"
        if [ -z "$lang" ]; then
            nm --defined-only "$out/kit.o" |
                awk '$3 !~ /^clothi?_|\.[0-9]+$/ { print $3 }' >"$out/local"    # x.0: inside a function
            none 'private names that do not start with clothi_' "$out/local"
        fi
        nm "$out/kit.o" | awk '$2 ~ /^[bBdDcCgGsS]$/ { print $3 }' >"$out/writable"
        none 'file-scope variables that can change' "$out/writable"
        nm -u "$out/kit.o" | awk '{ print $NF }' | sed 's/^__isoc99_//' | grep -E \
            '^(_*f?put[cs]|.*printf(_chk)?|.*scanf|strto.*|ato.*|_?exit|abort|longjmp|qsort|bsearch|rand|srand|time|clock|clock_gettime|getenv|setlocale|signal|__errno_location)$' \
            >"$out/imports"
        none 'library functions that the kit may not call' "$out/imports"
    fi
    if ! $cc -dM -E -x c /dev/null >/dev/null 2>&1; then
        skip 'macros of the headers: the compiler has no -dM'
        return
    fi
    for h in $headers; do sed -n '/immintrin\|arm_neon/d; s/^# *include *</#include </p' ../$h; done |
        sort -u >"$out/sys.h"
    for mode in '' -DCLOTHSIM_IMPLEMENTATION; do
        $cc -std=c99 -dM -E -include "$out/sys.h" $mode -x c /dev/null | sort >"$out/m0"
        for h in $headers; do
            $cc -std=c99 -dM -E -include "$out/sys.h" $mode -I.. -x c ../$h | sort >"$out/m1"
            comm -13 "$out/m0" "$out/m1" | awk '$2 !~ /^CLOTH(I|SIM)?_/ { print $2 }' >"$out/macros"
            none "macros of $h that do not start with CLOTH $mode" "$out/macros"
        done
    done
}

# Unit b in C is the kit as a user compiles it: the object that is measured. In C++ only its names
# matter, so there it is optimised in the long tier alone.
run_units() {
    languages=c
    cxx=
    for try in g++ clang++ c++; do have $try && { cxx=$try; break; }; done
    if [ -n "$cxx" ]; then languages='c c++'; else skip 'two units in C++: no compiler'; fi
    for side in a b; do for as in $languages; do
        if [ $as = c ]; then set -- $cc -std=c99 $warn $warn_c $base
        else
            set -- $cxx -std=c++11 $warn $base
            full || set -- "$@" -O0
        fi
        cpu; t0=$now
        must "unit $side as $as" "$@" -x $as -c two_units_$side.c -o "$out/$side.$as.o"
        cpu
        [ $side$as = bc ] && unit_size
    done; done
    for a in $languages; do for b in $languages; do
        case $a$b in *+*) link=$cxx ;; *) link=$cc ;; esac
        must "unit a in $a linked to b in $b" $link "$out/a.$a.o" "$out/b.$b.o" -lm -o "$out/two_units"
        must "unit a in $a with b in $b runs" "$out/two_units"
    done; done
}

unit_size() {
    h=clothsim.h
    size=$(($(wc -c <"$out/b.c.o" 2>/dev/null || echo 0)))
    echo "  $h: $(wc -l <../$h) lines, object $size bytes," \
         "compiled in $(awk "BEGIN { print $now - $t0 }") s at -O2"
    if [ $size -ge 291500 ]; then open object "$h: $size bytes (291500)"; else ok; fi
}

# orders of up to three headers, as -D options for compile_only.c
orders() {
    for a in $headers; do for b in $headers; do for c in $headers; do
        case $(printf '%s\n' $a $b $c | sort -u | wc -l):$(echo $headers | wc -w) in
        *1:*1|*2:*2|*3:*3) echo "-DFIRST=\"$a\" -DSECOND=\"$b\" -DTHIRD=\"$c\"" ;;
        esac
    done; done; done
}

one_compile() { must "compile_only.c: $*" "$@" $kit_warn -I.. -c compile_only.c -o "$out/one.o"; }

# Words that headers of systems take as macros (windows.h, complex.h) are no names of the kit.
compile_words() {
    printf '#include <complex.h>\n' >"$out/words.h"
    for word in near far small hyper interface pascal cdecl 'min(a, b) a' 'max(a, b) a' \
        unix linux huge; do
        case $word in
        unix | linux | small) printf '#undef %s\n#define %s 1\n' $word $word ;;
        *) printf '#define %s\n' "$word" ;;
        esac
    done >>"$out/words.h"
    one_compile $cc -std=c99 $(orders | head -n 1) -include "$out/words.h" -fsyntax-only
}

# What lets a compiler round otherwise than written is refused: where a macro shows it by #error, else
# when a model is made. Without FULL=1 the test that a model makes is asked alone.
compile_ieee() {
    awk -f inside.awk ../clothsim.h >"$out/clothsim.h"
    { echo '#define CLOTHSIM_IMPLEMENTATION'; echo '#include "clothsim.h"'
      echo 'int main(void) { return !clothi_ieee(); }'; } >"$out/ieee.c"
    for c in gcc clang; do
        have $c || continue
        compile="$c -std=c99 -w -O1 -I$out $out/ieee.c -o $out/fast -lm"
        must "taken: $c" sh -c "$compile && $out/fast"
        full && compile="$c -std=c99 -w -O1 -DCLOTHSIM_STATIC -I.. -I../examples \
            ../examples/01_hang.c -o $out/fast -lm"
        for flag in -ffast-math -funsafe-math-optimizations -freciprocal-math; do
            must "refused: $c $flag" sh -c "! { $compile $flag && $out/fast; }"
        done
    done
}

# The other orders of the headers; without FULL=1 by tcc, in no time, and the last by $cc.
compile_orders() {
    orders >"$out/orders"
    sed 1d "$out/orders" >"$out/others"         # the first has been
    last=$(tail -n 1 "$out/others")
    while read -r order; do
        if full || ! have tcc || [ "$order" = "$last" ]; then
            one_compile $cc -std=c99 $order -fsyntax-only
        else must "compile_only.c: tcc $order" tcc -std=c99 -Werror -I.. -c compile_only.c $order \
            -o "$out/one.o"
        fi
    done <"$out/others"
}

# A compiler makes code of the kit once a language, and once with wider registers; the rest is asked
# of its front end, which with clang also knows what an option leaves unused. Without FULL=1 code is
# made by clang of C alone, gcc's is the object of the tests and in C++ a unit of `units`; and gcc
# is spared options that clang is asked.
run_compile() {
    for pair in gcc:g++ clang:clang++; do
        c=${pair%:*} cxx=${pair#*:}
        kit_warn=$warn
        [ $c = clang ] && echo | clang -Werror -Wreserved-identifier -x c -c - -o "$out/one.o" \
            2>/dev/null && kit_warn="$warn -Wreserved-identifier"
        kit=$(orders | head -n 1)
        options='-DNDEBUG -DCLOTH_NO_STDIO -DCLOTH_ENABLE_VALIDATE' code= code_cxx=
        if ! full; then
            [ $c = gcc ] && code=-fsyntax-only && have clang && options=
            code_cxx=-fsyntax-only
        fi
        if have $c; then
            kit_warn="$kit_warn $warn_c"
            one_compile $c -std=c99 $kit $code
            [ "$(uname -m)" = x86_64 ] && one_compile $c -std=c99 $kit -mavx2 -mfma $code
            one_compile $c -std=c11 $kit -fsyntax-only
            for option in -DCLOTHSIM_STATIC -DCLOTH_NO_SIMD $options; do
                one_compile $c -std=c99 $kit $option -fsyntax-only
            done
            kit_warn=${kit_warn%"$warn_c"}
        else skip "compile with $c: not installed"
        fi
        if have $cxx; then
            one_compile $cxx -x c++ -std=c++11 $kit $code_cxx
            one_compile $cxx -x c++ -std=c++17 $kit -fsyntax-only
            one_compile $cxx -x c++ -std=c++11 $kit -DCLOTHSIM_STATIC -fsyntax-only
        else skip "compile with $cxx: not installed"
        fi
    done
    kit_warn="$warn $warn_c"
    compile_ieee
    compile_orders
}

run_programs() {                # of one compiler, or of both
    out=$out/${1:-both}
    mkdir -p "$out"
    for c in ${1:-gcc clang}; do
        have $c || { skip "programs with $c: not installed"; continue; }
        for file in $programs $examples; do
            flags=$(sh suite.sh flags "$file")
            if ! echo 'int x;' | $c $flags -x c -c - -o "$out/one.o" >/dev/null 2>&1; then
                skip "$file: $c lacks $flags"
                continue
            fi
            must "$c $file" $c -std=c99 $warn $warn_c $flags -I.. -I. -I../examples \
                -fsyntax-only "$file"
        done
    done
}

# The program stands in the header between '---- 01_hang.c ----' and '---- end ----', each line
# behind ' * ' and any indent; in the example without its comments that start in column 0; in
# README in the first ```c block that holds the implementation macro. Blank ends do not count.
squeeze() { awk '{ sub(/ +$/, "") } NF { if (gap && any) print ""; gap = 0; any = 1; print; next }
                 { gap = 1 }'; }

# quick_start HEADER EXAMPLE LINES: [1.1] of the header, at most so long, compiles and is the example
# without its lines that say view; the header's lines are left in $out/header.c.
quick_start() {
    header=$1 example=$2 lines=$3
    awk -v name="$example" 'index($0, "---- " name " ----") { on = 1; next }
         /---- end ----/ { on = 0 }
         on { if (!width && match($0, /^ \* +/)) width = RLENGTH
              print substr($0, width + 1) }' "../$header" | squeeze >"$out/header.c"
    if [ ! -s "$out/header.c" ]; then
        skip "[1.1] of $header has no lines between '---- $example ----' and '---- end ----'"
        return
    fi
    must "[1.1] of $header compiles" $cc -std=c99 -I.. $warn $warn_c -I../examples -fsyntax-only \
        "$out/header.c"
    must "[1.1] of $header has $(wc -l <"$out/header.c") lines" \
        test "$(wc -l <"$out/header.c")" -le "$lines"
    if [ -f "../examples/$example" ]; then
        awk '/^\/\*/ { skip = 1 } !skip { print } /\*\// { skip = 0 }' "../examples/$example" |
            grep -v view | squeeze >"$out/example.c"
        must "examples/$example is [1.1] of $header" diff "$out/header.c" "$out/example.c"
    else skip "examples/$example: not there"
    fi
}

run_quickstart() {
    quick_start clothsim.h 01_hang.c 30
    quick_start clothsim_grad.h 18_gradient.c 45
    quick_start clothsim_collide.h 12_drape.c 40
    [ -s "$out/header.c" ] || return
    awk '/^```c$/ { on = 1; text = ""; next }
         /^```$/ { if (on && text ~ /CLOTHSIM_IMPLEMENTATION/) { printf "%s", text; exit }
                   on = 0 }
         on { text = text $0 "\n" }' ../README.md | squeeze >"$out/readme.c"
    must 'the quick start of README is [1.1] of clothsim_collide.h' \
        diff "$out/header.c" "$out/readme.c"
    readme_blocks
    readme_commands
}

# Every other block of C in README is the inside of a function that has what a program has by then:
# its lines are compiled and run behind tests/readme.h, which makes a sim of the hooks that a block
# has set. Lines of make are targets that exist.
readme_blocks() {
    awk '/^```c$/ { on = 1; text = ""; next }
         /^```$/ { if (on && text !~ /CLOTHSIM_IMPLEMENTATION/) {
                       n++; printf "static int block%d(readme *r) {\n    README_NAMES(r)\n%s", n, text
                       print "    return readme_end_block(&desc);\n}" }
                   on = 0 }
         on { text = text "    " $0 "\n" (/status = .*;/ ? "    if (status) return status;\n" : "") }
         END { print "int main(void) {"; print "    readme r;"; print "    int bad = readme_start(&r);"
               for (i = 1; i <= n; i++) print "    if (!bad) bad = block" i "(&r);"
               print "    readme_end(&r);\n    return bad;\n}" }' ../README.md >"$out/blocks.c"
    echo '#define CLOTHSIM_IMPLEMENTATION' | cat - readme.h "$out/blocks.c" >"$out/readme_blocks.c"
    must 'the blocks of README compile' $cc -std=c99 -O0 -ffp-contract=off -I.. -I. \
        -I../examples -Wall -Wextra "$out/readme_blocks.c" -pthread -lm -o "$out/readme_blocks"
    must 'the blocks of README run' "$out/readme_blocks"
    for target in $(sed -n 's/^    make -C tests \([a-z]*\).*/tests:\1/p; s/^    make -C examples \([a-z]*\).*/examples:\1/p' \
            ../README.md); do
        must "make -C ${target%:*} ${target#*:}" grep -q "^${target#*:}:" "../${target%:*}/Makefile"
    done
}

# The compilers' lines of README beside drape.c, the quick start: run as they stand, and what they
# make prints what README says; without FULL=1 the first, the others' front ends take theirs, and
# CMake's program is built and not run. Those of a compiler that is not installed are skipped.
readme_commands() {
    dir=$out/user
    rm -rf "$dir" && mkdir -p "$dir/clothsim"
    cp ../clothsim.h ../clothsim_collide.h "$dir/clothsim"
    cp ../clothsim.h ../clothsim_collide.h "$dir"
    cp "$out/readme.c" "$dir/drape.c"
    printf '#define CLOTHSIM_IMPLEMENTATION\n#include "clothsim_collide.h"\n' >"$dir/cloth.c"
    promised=$(grep '^    after .* intersect: ' ../README.md | sed 's/^    //')
    sed -n 's/^    \(cc\|c++\|x86_64-w64-mingw32-gcc\) -std/\1 -std/p' ../README.md >"$out/commands"
    must 'README has a line for C, C++ and Windows' test "$(wc -l <"$out/commands")" -eq 3
    while read -r line; do
        if ! have "${line%% *}"; then skip "README: ${line%% *} is not installed"; continue; fi
        rm -f "$dir/a.out"
        case $line in
        cc*'&& ./a.out') readme_run ;;
        *'&& ./a.out')
            if full; then readme_run; else readme_take "${line%'&& ./a.out'}"; fi ;;
        *)  if full; then readme_windows; else readme_take "$line"; fi
            for side in '#include <windows.h>' ''; do        # first, last
                { echo "$side"; cat "$out/readme.c"; echo '#include <windows.h>'; } >"$dir/windows.c"
                must "windows.h ${side:+first}" ${line%% *} -std=c99 -w -I.. -fsyntax-only "$dir/windows.c"
            done ;;
        esac
    done <"$out/commands"
    readme_cmake
}

readme_run() {
    must "README: $line" sh -c "cd '$dir' && { $line; } >said"
    must "README: it prints '$promised'" test "$(cat "$dir/said")" = "$promised"
}

readme_take() { must "README: $1" sh -c "cd '$dir' && $1 -fsyntax-only"; }

readme_windows() {
    must "README: $line" sh -c "cd '$dir' && $line"
    wine=$(PATH=$PATH:/usr/lib/wine command -v wine64) ||
        { skip 'README: no wine64 to run drape.exe with'; return; }
    WINEDEBUG=-all "$wine" "$dir/drape.exe" 2>/dev/null | tr -d '\r' >"$dir/said"
    must "README: Windows prints '$promised'" test "$(cat "$dir/said")" = "$promised"
}

readme_cmake() {
    have cmake || { skip 'README: cmake is not installed'; return; }
    { echo 'cmake_minimum_required(VERSION 3.5)'; echo 'project(user C)'
      awk '/^```cmake$/ { on = 1; next } /^```$/ { on = 0 } on' ../README.md
      echo 'add_executable(drape drape.c)'; echo 'target_link_libraries(drape cloth)'
    } >"$dir/CMakeLists.txt"
    sed '/define CLOTHSIM_IMPLEMENTATION/d' "$out/readme.c" >"$dir/drape.c"
    set --
    have tcc && ! full && set -- -DCMAKE_C_COMPILER=tcc     # in no time
    must 'README: CMake configures' cmake -S "$dir" -B "$dir/build" "$@"
    must 'README: CMake optimises and contracts nothing' \
        grep -rq -e '-O2 -ffp-contract=off' "$dir/build/CMakeFiles/cloth.dir" --include=flags.make
    must 'README: CMake builds' cmake --build "$dir/build"
    full || return
    "$dir/build/drape" >"$dir/said" 2>&1
    must "README: CMake's prints '$promised'" test "$(cat "$dir/said")" = "$promised"
}

# Its own header line says how it is built; benches find it as out/bench/yardstick.
run_yardstick() {
    shared=${CLOTH_SHARED:-../../shared}
    src=$shared/yardstick/newton_proto.c
    if [ ! -f "$src" ]; then skip 'the yardstick is not beside the checkout'; return; fi
    mkdir -p out/bench
    line=$(sed -n 's/^ *\**  *\(g*cc .*newton_proto\.c.*\)$/\1/p' "$src" | head -n 1 |
           sed "s|newton_proto\.c|$src|; s| -o  *[^ ]*| -o out/bench/yardstick|")
    echo "  $line"
    must 'the yardstick builds' sh -c "$line"
}

# judge GARMENT BODY MOTION STEPS: one garment dressed and judged from each start.
judge() {
    garment=$1 body=$2 motion=$3 steps=${STEPS:-$4} start=0
    case $garment,$motion in *"${ONLY:-}"*) ;; *) return ;; esac
    data=$shared/data
    for file in garments/$garment.obj $body/body.obj $body/weights_cmu.txt motion/$motion.skin; do
        [ -f "$data/$file" ] || { skip "$garment on $motion: no $file"; return; }
    done
    while [ $start -lt "${STARTS:-1}" ]; do
        judge_start
        start=$((start + 1))
    done
}

# A line of the table. A step counts as whole when nothing of it was halved; dress.c counts the
# halvings, so there are at least so many whole steps. Start n: the first vertex n nm along x.
judge_start() {
    name="$garment $motion" worn=$data/garments/$garment.obj
    if [ $start -gt 0 ]; then
        name="$name +$start nm" worn=$out/garment.obj
        awk -v by=$start '$1 == "v" && !n++ { $2 = sprintf("%.12f", $2 + 1e-9 * by) } { print }' \
            "$data/garments/$garment.obj" >"$worn"
    fi
    "$out/dress" "$out/judged.seq" "$steps" "$worn" "$data/$body/body.obj" \
        "$data/$body/weights_cmu.txt" "$data/motion/$motion.skin" >"$out/dressed" 2>&1
    sum=$(sed -n 's/.*SUMMARY //p' "$out/dressed")
    case $sum in *', failed '*) ;; *) bad "$name: $sum"; return ;; esac
    "$out/swallowed" "$out/judged.seq" >"$out/swallow"
    echo "$sum $(cat "$out/swallow")" | awk -v name="$name" -v line="$out/line" '
        function after(what,   rest) {
            rest = substr($0, index($0, what " ") + length(what) + 1)
            sub(/[ ,].*/, "", rest)
            return rest + 0
        }
        {   steps = after(", steps"); halved = after("halved"); failed = after(", failed")
            whole = steps - halved - failed
            if (whole < 0) whole = 0
            worst = after("worst"); mean = after(", mean"); stretch = after("max stretch")
            printf "  %-36s %5d %7.2f %5d %7.3f %7.1f %8.2f %6d %6d %6d\n", name, steps, worst, \
                after("at frame"), mean, after("deepest"), stretch, failed, whole, after("ms mean")
            if (worst > 1) over = over sprintf("; worst frame %.1f %% (1)", worst)
            if (mean > 0.2) over = over sprintf("; mean %.2f %% (0.2)", mean)
            if (stretch > 2.5) over = over sprintf("; stretch %.2f (2.5)", stretch)
            if (failed > 0) over = over sprintf("; failed steps %d (0)", failed)
            if (whole < 0.95 * steps) over = over sprintf("; whole steps %d of %d (95 %%)", whole, \
                                                          steps)
            print substr(over, 3) >line }'
    if [ -s "$out/line" ] && [ -n "$(cat "$out/line")" ]; then
        open "$name" "$(cat "$out/line")"
    else ok
    fi
    rm -f "$out/judged.seq"
}

# Both programs know nothing of the kit's inside; they are compiled where they lie, never copied.
run_judges() {
    shared=${CLOTH_SHARED:-../../shared}
    if [ ! -f "$shared/judge/dress.c" ] || [ ! -f "$shared/judge/swallowed.c" ]; then
        skip 'the judges are not beside the checkout'
        return
    fi
    must 'dress.c builds' $cc -std=gnu99 -O2 -w -ffp-contract=off -I.. "$shared/judge/dress.c" \
        -o "$out/dress" -lm
    must 'swallowed.c builds' $cc -std=gnu99 -O3 -march=native -ffast-math -w \
        "$shared/judge/swallowed.c" -o "$out/swallowed" -lm
    [ $failed -eq 0 ] || return
    printf '  %-36s %5s %7s %5s %7s %7s %8s %6s %6s %6s\n' 'garment, motion' steps 'worst %' frame \
        'mean %' 'deep mm' stretch failed whole 'ms'
    for garment in tshirt_f_clean trousers_f_clean skirt_f_clean longskirt_f_clean; do
        judge $garment body walk_02_01 120
        judge $garment body punch_02_05_f 200
    done
    for garment in poloshirt_m_clean longskirt_m_clean; do
        judge $garment body_m jump_02_04 200
        judge $garment body_m punch_02_05_m 200
    done
}

run_fuzz() {
    seconds=$1
    shift
    if ! have clang; then skip 'fuzzers: no clang'; return; fi
    [ $# -gt 0 ] || skip 'there is no fuzz_*.c'
    for file in "$@"; do
        name=${file%.c}
        mkdir -p "$out/$name.corpus"
        seeds=
        [ -d "fuzz/$name" ] && seeds=fuzz/$name
        flags=-DCLOTHSIM_IMPLEMENTATION
        sh suite.sh has_implementation "$file" && flags=
        if ! clang -std=c99 -O1 -g -ffp-contract=off -fsanitize=fuzzer,address,undefined \
                -fno-sanitize-recover=all $flags -I.. -I. "$file" -lm -o "$out/$name" \
                2>"$out/said"; then
            bad "$file does not build"
            cat "$out/said"
            continue
        fi
        if "$out/$name" -max_total_time="$seconds" -timeout=60 -len_control=0 -max_len=1024 \
                -rss_limit_mb=2048 -artifact_prefix="$out/$name." \
                "$out/$name.corpus" $seeds >"$out/$name.log" 2>&1
        then ok; tail -n 1 "$out/$name.log"
        else bad "$file: see $out/$name.log"; tail -n 40 "$out/$name.log"
        fi
    done
}

case $check in
text|comments|commands|names|units|compile|programs|quickstart|judges|yardstick|fuzz)
    run_"$check" "$@" ;;
*) echo "checks.sh: there is no check '$check'" >&2; exit 2 ;;
esac
cpu
[ $((passed + failed + skipped)) -eq 0 ] && skip 'there is nothing to check yet'
echo "checks.sh $check: $passed passed, $failed failed, $skipped skipped ($now s)"
[ "$failed" -eq 0 ]
