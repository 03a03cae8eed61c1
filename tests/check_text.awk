# check_text.awk - what a reader's eye would catch, caught before. Run by checks.sh text.
#   LC_ALL=C awk -v check=lines     -f check_text.awk FILES    width, tabs, ASCII, unfinished notes
#   LC_ALL=C awk -v check=contents  -f check_text.awk HEADER   every tag of CONTENTS has one banner
#   LC_ALL=C awk -v check=functions -f check_text.awk FILES    no function over 60 lines, unless the
#                                       section's banner or comment says 'straight derivation'
#   LC_ALL=C awk -v check=cites     -f check_text.awk FILES    every tests/... named does exist
# Prints file:line: what; exit status 1 when there was anything to print.

function complain(line, what) {
    printf "%s:%d: %s\n", FILENAME, line, what
    bad = 1
}

# The tag and title at the start of s, spaces trimmed.
function trim(s) {
    gsub(/^[ *]+|[ *]+$/, "", s)
    return s
}

BEGIN { unfinished = "TO" "DO|FIX" "ME|XX" "X" }

FNR == 1 {
    last_line = section_line = signature = body = derivation = 0
    in_contents = ended = 0
}

check == "lines" {
    if (length($0) > 100) complain(FNR, "longer than 100 columns (" length($0) ")")
    if (index($0, "\t")) complain(FNR, "a tab")
    else if ($0 ~ /[^ -~]/) complain(FNR, "not printable ASCII")
    if ($0 ~ / $/) complain(FNR, "a space at the end")
    if ($0 ~ "(^|[^A-Za-z_])(" unfinished ")([^A-Za-z_]|$)") complain(FNR, "an unfinished note")
}

# The contents end with their comment; a banner is '/* ===== [n.m] TITLE =====' from column 0.
check == "contents" {
    if ($0 ~ /^ \* CONTENTS/) in_contents = 1
    else if (in_contents) {
        rest = $0
        while (match(rest, /\[[0-9]+\.[0-9]+\]/)) {
            tag = substr(rest, RSTART, RLENGTH)
            rest = substr(rest, RSTART + RLENGTH)
            title = rest
            if (match(title, /\[[0-9]+\.[0-9]+\]/)) title = substr(title, 1, RSTART - 1)
            sub(/\*\/.*/, "", title)
            if (tag in listed) complain(FNR, tag " is listed twice")
            listed[tag] = FNR
            name[tag] = trim(title)
            order[++tags] = tag
        }
    }
    if (in_contents && /\*\//) in_contents = 0
    if (match($0, /^\/\* ===== \[[0-9]+\.[0-9]+\] /)) {
        tag = substr($0, 10, RLENGTH - 10)
        title = substr($0, RLENGTH + 1)
        sub(/ =+( *\*\/)?$/, "", title)
        if (tag in banner) complain(FNR, tag " has a second banner, the first in line " banner[tag])
        banner[tag] = FNR
        heading[tag] = trim(title)
        if (!(tag in listed)) complain(FNR, "the contents lack " tag)
        else if (heading[tag] != name[tag])
            complain(FNR, tag " is '" heading[tag] "' here, '" name[tag] "' in the contents")
    }
}

# A signature starts in column 0; its body opens with ') {' at the end of a line, closes with '}'.
check == "functions" {
    if (/^\/\* ===== \[/) derivation = 0
    if (/straight derivation/) derivation = 1
    if (body) {
        if (/^}/) {
            if (FNR - signature + 1 > 60 && !derivation)
                complain(signature, "a function of " FNR - signature + 1 " lines")
            signature = body = 0
        }
    } else if (/^[A-Za-z]/ || signature) {
        if (/^[A-Za-z]/) signature = FNR
        if (/\) \{$/) body = 1
        else if (/[;}]$/ || /^$/) signature = 0
    }
}

check == "cites" {
    rest = $0
    while (match(rest, /tests\/[a-z0-9_\/]+\.[a-z]+/)) {
        path = substr(rest, RSTART, RLENGTH)
        rest = substr(rest, RSTART + RLENGTH)
        if (path ~ /\.(c|h|sh|awk)$/ && (getline any < ("../" path)) < 0)
            complain(FNR, path " does not exist")
        close("../" path)
    }
}

END {
    if (check == "contents") {
        if (!tags) complain(1, "no contents")
        for (i = 1; i <= tags; i++) {
            if (!(order[i] in banner)) complain(listed[order[i]], "no banner " order[i])
            else if (i > 1 && banner[order[i]] < banner[order[i - 1]])
                complain(banner[order[i]], order[i] " stands before " order[i - 1])
        }
    }
    exit bad
}
