#!/bin/sh
# figures.sh - the figures of the documents (ACCURACY.md, SPEED.md, ..) against what is printed.
#   make -C tests validate && cd tests && sh figures.sh         or: sh figures.sh LOGS
# figures.txt says where each stands. LOGS: directory of the programs' output, out/o2; examples' is
# in ../examples/out, that of bench/ in out/bench. A program that has not run is skipped, with a
# sentence. CPU times belong to a machine: only that the program prints one is checked.
# Last line: 'figures.sh: N passed, N failed, N skipped'.
LC_ALL=C
export LC_ALL
logs=${1:-out/o2}
awk -F ' [|] ' -v logs="$logs" '
    function bad(text) { failed++; print "  FAILED: " $1 ": " $2 ": " text }
    # the figure as it is written, of what was printed
    function shown(value, like,   digits) {
        if (like ~ /%$/) {
            like = substr(like, 1, length(like) - 2)
            value *= 100
        }
        if (like ~ /e/) {
            digits = like ~ /[.]/ ? length(like) - index(like, ".") - (length(like) - index(like, "e") + 1) : 0
            value = sprintf("%." digits "e", value)
            sub(/e-0/, "e-", value)
            return value
        }
        return sprintf("%." (like ~ /[.]/ ? length(like) - index(like, ".") : 0) "f", value)
    }
    /^#/ || NF < 6 { next }
    {
        log_file = $2 ~ /^examples/ ? "../" $2 : ($2 ~ /^bench/ ? "out/bench" : logs) "/" $2
        if ($2 ~ /^examples/) sub(/examples/, "examples/out", log_file)
        pattern = substr($3, 2, length($3) - 2)
        n = lines = 0
        while ((getline line < (log_file ".log")) > 0) {
            lines++
            if (line !~ pattern) continue
            count = split(line, field, /[ ,;|]+/)
            first = field[1] == "" ? 1 : 0
            at = $4 < 0 ? count + $4 + 1 : $4 + first
            value = field[at]
            gsub(/^[+]-|[:m]$/, "", value)
            value = value < 0 ? -value : value + 0
            n++
            if ($5 ~ /^[0-9]+$/ ? n == $5 : n == 1 || $5 ~ /^(last|one|time)$/ ||
                                            ($5 == "min" ? value < best : value > best))
                best = value
        }
        close(log_file ".log")
        if (!lines) { skipped++; if (!told[$2]++) print "  skipped: " $2 ": not run"; next }
        if (!n) { bad("prints no line " $3); next }
        if ($5 == "one") best = best > 1 ? best - 1 : 1 - best
        figure = number = $6
        sub(/ [a-z].*/, "", number)         # a figure may have words behind it
        got = shown(best, number)
        sub(/ %/, "", number)
        near = $5 == "time" ? best > 0 : $5 == "worse" && got + 0 > number / 3.01 && got + 0 < number * 3.01
        if (got != number && !near) { bad("prints " got ", the document has " figure); next }
        found = 0
        while ((getline line < $1) > 0)
            if (index(line, figure) && index(line, NF > 6 ? $7 : $2 ".c")) found = 1
        close($1)
        if (found) passed++
        else bad("its row has no " figure)
    }
    END {
        print "figures.sh: " passed + 0 " passed, " failed + 0 " failed, " skipped + 0 " skipped"
        exit failed > 0
    }' figures.txt
