#!/bin/sh
# suite.sh - what tests/Makefile asks of a shell. Run from tests/.
#   suite.sh line FILE...      the compile line that the first comment of each file holds
#   suite.sh flags FILE        flags of that line beyond the standard ones (-pthread, -mavx2, -DX);
#                              -O and -march are the Makefile's to say
#   suite.sh select FILE...    those that belong to $TIER: quick, default or full
#   suite.sh build SRC EXE     compile one program (environment: see the Makefile's exports)
#   suite.sh run SRC EXE       run it, keep its output in EXE.log, print its last line
#   suite.sh check NAME EXE    the same for one check of checks.sh
#   suite.sh report NAME...    failures in full, skipped, the five slowest, what is open (a bound
#                              that does not hold yet, OPEN of test.h), 'N passed, N failed'
#   suite.sh tag, built, shown, expected     for examples/Makefile, run from examples/
# A program is out/<flavour>/<path without .c>; its output is that name with .log appended.
LC_ALL=C
export LC_ALL

first_comment() { awk 'NR == 1 && !/^\/\*/ { exit } { print } /\*\// { exit }' "$1"; }

compile_line() {
    first_comment "$1" | awk '
        more { sub(/^[ *]+/, ""); line = line " " $0; more = 0 }
        !line { text = $0; sub(/^[ *\/]+/, "", text); sub(/^[a-z ]+: */, "", text)
                if (text ~ /^(cc|gcc|clang|c99) /) line = text }
        line { if (sub(/ *\\ *$/, "", line)) { more = 1; next }
               sub(/ *(\*\/|&&|;).*$/, "", line); print line; exit }'
}

# 0 when the file compiles the implementation itself
has_implementation() {
    grep -Eq '^ *# *define +CLOTHSIM_([A-Z]+_)?IMPLEMENTATION' "$1"
}

extra_flags() {
    for word in $(compile_line "$1"); do
        case $word in
        -std=*|-O?|-march=*|-ffp-contract=off|-I..|-I.|-lm|-o|-DCLOTHSIM_IMPLEMENTATION) ;;
        -*) printf '%s ' "$word" ;;
        esac
    done
}

tier_of() {
    tag=$(first_comment "$1" | sed -n 's/.*tier: *\([a-z]*\).*/\1/p' | head -n 1)
    case $tag:$1 in
    quick:*|default:*|full:*) echo "$tag" ;;
    *:validate/*) echo default ;;
    *:stability/*) echo full ;;
    *) echo quick ;;
    esac
}

rank() { case $1 in quick) echo 0 ;; default) echo 1 ;; *) echo 2 ;; esac; }

select_programs() {
    for file in "$@"; do
        [ -f "$file" ] || continue
        case $file in *"${ONLY:-}"*) ;; *) continue ;; esac
        if [ -n "${X_CXX:-}" ] && first_comment "$file" | grep -q 'language: C only'; then
            continue
        fi
        [ "$(rank "$(tier_of "$file")")" -le "$(rank "${TIER:-default}")" ] && echo "$file"
    done
}

build() {
    src=$1 exe=$2
    rm -f "$exe" "$exe.log"
    flags=$(extra_flags "$src")
    if [ -n "$flags" ] && ! echo 'int main(void) { return 0; }' |
            $X_CC $X_FLAGS $flags -x ${X_CXX:-c} - -o "$exe.probe" -lm >"$exe.build" 2>&1; then
        echo "the compiler lacks $flags" >"$exe.skip"
        return 0
    fi
    rm -f "$exe.probe" "$exe.skip"
    # a program that looks at private functions compiles those that it calls (inside.awk); an example,
    # a bench that names the header by its path, or one with flags that the object has not, all
    object=$X_OBJECT own=
    if has_implementation "$src"; then
        own=-I$X_OUT/inside
        case $flags in *-D*) own= ;; esac
        grep -Eq '^ *# *include +"clothsim' "$src" || own=
        [ -n "$own" ] && [ -d "$X_OUT/inside" ] || { object= own=-DCLOTHSIM_STATIC; }
    fi
    if [ -n "$object" ] && [ ! -f "$object" ]; then
        echo "$object did not build" >"$exe.build"
        return 0
    fi
    # libraries follow the source; -x none ends the forced language before the object file
    $X_CC $own $X_FLAGS ${X_CXX:+-x c++} "$src" ${X_CXX:+-x none} $object $flags -lm -o "$exe" \
        >"$exe.build" 2>&1
    return 0
}

run() {
    src=$1 exe=$2
    page=$(tag page "$src")
    [ -n "$page" ] && rm -f "$page"         # an old page must not pass for a new one
    limit=
    command -v timeout >/dev/null 2>&1 && limit="timeout ${SECONDS_MAX:-900}"
    if [ -f "$exe.skip" ]; then
        echo "  skipped: $(cat "$exe.skip")" >"$exe.log"
        echo "$src: 0 passed, 0 failed, 1 skipped (0 s)" >>"$exe.log"
        rc=0
    elif [ ! -x "$exe" ]; then
        { echo "$src did not build:"; cat "$exe.build"; } >"$exe.log" 2>&1
        rc=127
    else
        $limit ${RUNNER:-} "$exe" >"$exe.log" 2>&1
        rc=$?
    fi
    finish "$src" "$exe" "$rc"
}

check() {
    sh checks.sh "$1" >"$2.log" 2>&1
    finish "checks.sh $1" "$2" $?
}

finish() {
    echo "$3" >"$2.rc"
    line=$(tail -n 1 "$2.log")
    if [ "$3" -eq 0 ] && [ -n "${SHOW:-}" ]; then cat "$2.log"
    elif [ "$3" -eq 0 ]; then
        case $line in "${1##*/}":*) echo "$line" ;; *) echo "$1: $line" ;; esac
    else echo "$1: FAILED (exit status $3)"
    fi
}

# One line of input a program: its log without the ending. The counts of a program come from its
# last line; a program that crashes or prints no such line counts as one failed test.
report() {
    mkdir -p "$X_OUT"
    for name in "$@"; do echo "$X_OUT/$name"; done | awk -v total_file="$X_OUT/total" \
            -v open_file="$X_OUT/open" '
        function slurp(file,   line) {
            text = last = ""
            while ((getline line < file) > 0) {
                text = text "    " line "\n"
                if (line ~ / [0-9]+ passed, [0-9]+ failed, [0-9]+ skipped \([0-9.]+ s\)$/)
                    last = line
                else if (line ~ /: open: /) {
                    sub(/^ */, "", line)
                    opens[++nopens] = name ": " line
                } else if (line ~ /skipped: /) skips[++nskips] = name ": " line
            }
            close(file)
        }
        {
            name = $0; sub(/^out\/[^\/]*\//, "", name)
            rc = ""; getline rc < ($0 ".rc"); close($0 ".rc")
            slurp($0 ".log")
            why = ""
            n = split(last, word, /[ ,():]+/)
            if (n < 8) why = "printed no count of tests"
            else {
                # ..., P, passed, F, failed, S, skipped, seconds, s, ""
                p = word[n - 8]; f = word[n - 6]; s = word[n - 4]; t = word[n - 2]
                passed += p; failed += f; skipped += s
                seconds[name] = t + 0
                if (f > 0) why = f " failed"
                else if (p + s == 0) why = "ran no test"
            }
            if (rc != "0" && (n < 8 || f == 0))
                why = (rc == "124" ? "ran too long" : "exit status " (rc == "" ? "unknown" : rc)) \
                    (n < 8 ? ", " why : ", although all its tests passed")
            if (why != "") {
                if (n < 8 || f == 0) failed++
                printf "\n%s: %s\n%s", name, why, text
            }
        }
        END {
            if (nskips) print "\nskipped:"
            for (i = 1; i <= nskips; i++) print "  " skips[i]
            print "\nslowest (CPU seconds):"
            for (i = 0; i < 5; i++) {
                top = ""
                for (k in seconds) if (top == "" || seconds[k] > seconds[top]) top = k
                if (top == "") break
                printf "  %8.2f  %s\n", seconds[top], top
                delete seconds[top]
            }
            printf "" > open_file
            if (nopens) print "\nopen, bounds that do not hold yet (counted as skipped):"
            for (i = 1; i <= nopens; i++) {
                print "  " opens[i]
                print opens[i] > open_file
            }
            line = passed + 0 " passed, " failed + 0 " failed"
            if (skipped) line = line ", " skipped " skipped"
            print "\n" line
            print line > total_file
            exit failed != 0 || passed == 0
        }'
}

# ---- for examples/Makefile

# tag NAME FILE: what follows 'NAME:' in the first comment
tag() { first_comment "$2" | sed -n "s/^[ *]*$1: *//p" | sed 's/ *\*\/$//' | head -n 1; }

built() {
    [ -x "$1" ] || [ -f "$1.skip" ] || { echo "$1 did not build:"; cat "$1.build"; return 1; }
    [ ! -f "$1.skip" ] || echo "$1: skipped: $(cat "$1.skip")"
}

# shown SRC EXE: the example ran and its page is there
shown() {
    page=$(tag page "$1")
    if [ "$(cat "$2.rc")" != 0 ] || [ ! -s "$page" ]; then
        echo "$1: exit status $(cat "$2.rc"), its output:"
        cat "$2.log"
        [ -s "$page" ] || echo "$1 wrote no $page"
        return 1
    fi
    echo "  $1 wrote $page"
}

# expected NAME...: the last line of each example is the one that its comment promises
expected() {
    passed=0 failed=0 skipped=0
    for name in "$@"; do
        if [ -f "$X_OUT/$name.skip" ]; then
            echo "$name.c: skipped: $(cat "$X_OUT/$name.skip")"
            skipped=$((skipped + 1))
            continue
        fi
        want=$(tag expected "$name.c")
        got=$(tail -n 1 "$X_OUT/$name.log")
        page=$(tag page "$name.c")
        if [ -z "$want" ]; then why="says no 'expected: ...' in its first comment"
        elif [ "$(cat "$X_OUT/$name.rc")" != 0 ]; then why="exit status $(cat "$X_OUT/$name.rc")"
        elif [ "$want" != "$got" ]; then why="last line is not '$want'"
        elif [ -n "$page" ] && [ ! -s "$page" ]; then why="wrote no $page"
        else passed=$((passed + 1)); continue
        fi
        failed=$((failed + 1))
        echo "$name.c: $why; its output ends:"
        tail -n 20 "$X_OUT/$name.log" | sed 's/^/    /'
    done
    line="$passed passed, $failed failed"
    [ $skipped -gt 0 ] && line="$line, $skipped skipped"
    mkdir -p "$X_OUT"
    echo "$line" | tee "$X_OUT/total"
    [ $failed -eq 0 ]
}

verb=$1
shift
case $verb in
line) for file in "$@"; do compile_line "$file"; done ;;
flags) extra_flags "$1" ;;
select) select_programs "$@" ;;
build|run|check|report|tag|built|shown|expected) $verb "$@" ;;
has_implementation) has_implementation "$1" ;;
*) echo "suite.sh: unknown verb $verb" >&2; exit 2 ;;
esac
