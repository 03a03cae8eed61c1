#!/bin/sh
# gallery.sh - writes out/index.html: a still, a sentence and a link for each page of the examples.
#   sh gallery.sh NN_name.c ...     run by make -C examples show, in examples/
# The title is the page's own, the sentence the first line of the program's opening comment. Pages
# that are not there are named at the end; out/live.html, where it was made, comes first.
LC_ALL=C
export LC_ALL
capital() { printf '%s%s' "$(printf '%s' "$1" | cut -c1 | tr '[:lower:]' '[:upper:]')" \
    "$(printf '%s' "$1" | cut -c2-)"; }
escape() { sed 's/&/\&amp;/g; s/</\&lt;/g'; }

card() {                        # card HREF STILL TITLE SENTENCE
    printf "<a href='%s#all'>" "$1"
    if [ -f "out/$2" ]; then printf "<img src='%s' width='480' height='300' alt=''>" "$2"
    else printf "<span class='none'></span>"
    fi
    printf "<h2>%s</h2><p>%s</p></a>\n" "$3" "$4"
}

{
    cat <<'HTML'
<!DOCTYPE html>
<html lang='en'><head><meta charset='utf-8'>
<meta name='viewport' content='width=device-width, initial-scale=1'>
<title>clothsim: pages</title>
<style>
:root { color-scheme: light dark; --bg: #f6f5f2; --panel: #fff; --ink: #1d2126; --soft: #596068;
  --line: #d9d7d1; --accent: #1f5fa8; }
@media (prefers-color-scheme: dark) { :root { --bg: #15181c; --panel: #1e2227; --ink: #e9eaec;
  --soft: #a6aeb8; --line: #363c44; --accent: #7db4f0; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1180px; padding: 22px 18px 40px; background: var(--bg);
  color: var(--ink); font: 15px/1.45 system-ui, -apple-system, 'Segoe UI', Roboto,
  'Liberation Sans', sans-serif; }
h1 { font-size: 24px; margin: 0; }
body > p { margin: 4px 0 18px; color: var(--soft); max-width: 70ch; }
main { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 320px), 1fr));
  gap: 16px; }
main a { display: block; background: var(--panel); border: 1px solid var(--line);
  border-radius: 10px; overflow: hidden; color: inherit; text-decoration: none; }
main a:hover { border-color: var(--accent); }
main a:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
img, .none { display: block; width: 100%; height: auto; aspect-ratio: 8 / 5; object-fit: contain; }
h2 { font-size: 16px; margin: 10px 14px 0; color: var(--accent); }
main p { margin: 2px 14px 12px; color: var(--soft); }
</style></head><body>
<h1>clothsim</h1>
<p>Finite-element cloth in C, headers only. Each page is the run of one example, stored frame by
frame: drag to turn it, press Source to read the program that made it.</p>
<main>
HTML
    [ -f out/live.html ] && card live.html live.png 'Live: pull it yourself' \
        'The kit itself, compiled to WebAssembly, steps while you watch.'
    missing=
    for file in "$@"; do
        page=$(sed -n 's/^ \* *page: *out\///p' "$file" | sed 's/ *\*\/ *$//' | head -n 1)
        [ -n "$page" ] || continue
        [ -f "out/$page" ] || { missing="$missing ${file%.c}"; continue; }
        still=${page%.html}.png
        case $page in
        *.svg)
            still=$page
            title=$(sed -n "s/.*aria-label='\([^']*\)'.*/\1/p" "out/$page" | head -n 1) ;;
        *) title=$(sed -n 's/^const D = {title:"\([^"]*\)".*/\1/p' "out/$page" | head -n 1) ;;
        esac
        title=$(capital "$title" | escape)
        # the opening comment's first paragraph
        text=$(awk '/^ \* *$/ { exit } { sub(/^ \* /, ""); printf "%s%s", (NR > 1 ? " " : ""), $0 }' \
            "$file" | sed 's/^[^ ]* [^ ]* - //')
        card "$page" "$still" "$title" "$(capital "$text" | escape)"
    done
    printf '</main>'
    [ -z "$missing" ] || printf "<p>Not run yet, they take longest:%s: %s</p>" \
        "$(printf '%s' "$missing" | sed 's/\([^ ]\) /\1, /g')" '<code>make -C examples pages</code>'
    printf '</body></html>\n'
} >out/index.html
