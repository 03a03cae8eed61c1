#!/bin/sh
# full.sh MAKE - the long tier: every program with FULL=1, then sanitizers, memcheck, coverage.
# Run from tests/ by 'make -C tests full'. Stages need gcc, clang, valgrind, gcov: those that are
# absent are named and left out. The last line adds up the stages.
LC_ALL=C
export LC_ALL
make=${1:-make}
totals=
have() { command -v "$1" >/dev/null 2>&1; }

# stage NAME FLAVOUR VARIABLE=VALUE...: one suite in out/FLAVOUR
stage() {
    name=$1 flavour=$2
    shift 2
    printf '\n==== %s\n\n' "$name"
    start=$(date +%s)
    $make --no-print-directory -j2 suite "FLAVOUR=$flavour" "$@"
    [ -f "out/$flavour/total" ] || { mkdir -p "out/$flavour"
                                     echo '0 passed, 1 failed' >"out/$flavour/total"; }
    echo "$name: $(cat "out/$flavour/total"), $(($(date +%s) - start)) s" >"out/$flavour/stage"
    totals="$totals out/$flavour/stage"
}

# Lines of each header that no test ran; the headers' own checks of CLOTH_VALIDATE and the
# assertion failures aside. Counts of all objects are added up.
coverage() {
    find "$(pwd)/out/cov" -name '*.gcda' >out/cov/gcda
    mkdir -p out/cov/gcov
    cp ../clothsim*.h out/cov               # gcov writes where it stands and looks for ../*.h
    while read -r data; do
        (cd out/cov/gcov && rm -f ./*.gcov && gcov "$data" >/dev/null 2>&1
         for h in clothsim*.h.gcov; do [ -f "$h" ] && cat "$h"; done)
    done <out/cov/gcda | awk -F: '
        $3 == "Source" || $2 + 0 == 0 { if ($3 == "Source") { n = split($4, part, "/")
                                                            header = part[n] }
                                        next }
        { count = $1; gsub(/[ *]/, "", count); line = $2 + 0; key = header ":" line }
        count == "-" { next }
        {   text = $0; sub(/^[^:]*:[^:]*:/, "", text)
            if (text ~ /CLOTH_VALIDATE/) next
            seen[key] = 1; source[key] = text; last[header] = line > last[header] ? line : last[header]
            if (count !~ /^[#=]/) ran[key] = 1 }
        END {
            for (h in last) {
                all = hit = 0
                for (i = 1; i <= last[h]; i++) {
                    key = h ":" i
                    if (!(key in seen)) continue
                    all++
                    if (key in ran) hit++
                    else print key ":" source[key]
                }
                printf "%s: %d of %d lines run, %d not\n", h, hit, all, all - hit
            }
        }'
}

mkdir -p out
FULL=1 && export FULL
SECONDS_MAX=7200 && export SECONDS_MAX
stage 'every test, full size' o2 TIER=full \
    CHECKS='judges text comments commands names units compile programs quickstart'
unset FULL
QUICK=1 && export QUICK
if have gcc; then
    stage 'address and undefined behaviour sanitizers' asan TIER=quick CC=gcc OPT='-O1 -g' \
        SANITIZE='-fsanitize=address,undefined -fno-sanitize-recover=all'
fi
if have valgrind; then
    stage 'valgrind memcheck' memcheck TIER=quick OPT='-O1 -g' \
        RUNNER='valgrind -q --error-exitcode=9 --leak-check=full --errors-for-leak-kinds=all'
else echo 'valgrind: skipped: not installed'
fi
unset QUICK
if have gcc && have gcov; then
    rm -rf out/cov
    stage 'coverage' cov TIER=default CC=gcc OPT='-O0 --coverage'
    coverage
else echo 'coverage: skipped: needs gcc and gcov'
fi
if have clang; then
    printf '\n==== fuzzers, 30 s each\n\n'
    mkdir -p out/fuzz
    sh checks.sh fuzz 30 fuzz_*.c | tee out/fuzz/log
    sed -n 's/^checks.sh fuzz: /fuzzers: /p' out/fuzz/log >out/fuzz/stage
    [ -s out/fuzz/stage ] || echo 'fuzzers: 0 passed, 1 failed' >out/fuzz/stage
    totals="$totals out/fuzz/stage"
else echo 'fuzzers: skipped: no clang'
fi

if [ -s out/o2/open ]; then
    printf '\n==== open: bounds that do not hold yet\n\n'
    cat out/o2/open
fi
printf '\n==== all stages\n\n'
cat $totals
cat $totals | sed 's/.*: \([0-9].*\)/\1/' | awk '
    { p += $1; f += $3; if ($6 ~ /^skipped/) s += $5 }
    END { line = p " passed, " f " failed"; if (s) line = line ", " s " skipped"
          print "\n" line; exit f != 0 }'
