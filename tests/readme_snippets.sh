#!/bin/sh
# readme_snippets.sh TOP: every ```cpp block of TOP/README.md must follow a line
#     <!-- from examples/NAME.cpp -->
# and stand, indentation aside, as consecutive lines in that file.
set -eu
top=$1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Cuts the blocks out: $work/N.block and, in $work/N.file, the file that it names.
awk -v work="$work" '
  /^<!-- from [^ ]+ -->[ \t]*$/ { named = $3; next }
  /^```/ {
    if (inside) { inside = 0; copying = 0; named = ""; next }
    inside = 1
    if ($0 ~ /^```cpp[ \t]*$/) {
      copying = 1
      ++count
      print named > (work "/" count ".file")
      print NR > (work "/" count ".line")
      printf "" > (work "/" count ".block")
    }
    next
  }
  copying { print > (work "/" count ".block"); next }
  !/^[ \t]*$/ { named = "" }
  END { if (inside) { print "README.md: a block is not closed"; exit 1 } }
' "$top/README.md"

found=0
bad=0
for block in "$work"/*.block; do
  [ -e "$block" ] || break
  found=$((found + 1))
  file=$(cat "${block%.block}.file")
  where="README.md:$(cat "${block%.block}.line")"
  if [ -z "$file" ]; then
    echo "$where: the block does not follow a line <!-- from examples/NAME.cpp -->"
    bad=1
  elif [ ! -f "$top/$file" ]; then
    echo "$where: there is no $file"
    bad=1
  elif ! awk -v block="$block" '
      function trimmed(line) { sub(/^[ \t]+/, "", line); sub(/[ \t\r]+$/, "", line); return line }
      BEGIN { while ((getline line < block) > 0) { want[++n] = trimmed(line) } }
      { have[NR] = trimmed($0) }
      END {
        for (start = 1; start + n - 1 <= NR && n > 0; ++start) {
          same = 0
          while (same < n && have[start + same] == want[same + 1]) { ++same }
          if (same == n) { exit 0 }
          if (same > best) { best = same; at = start }
        }
        printf "its line %d, \"%s\", does not continue line %d there\n", best + 1, want[best + 1], at + best - 1
        exit 1
      }' "$top/$file" > "$work/why"; then
    echo "$where: the block is not in $file: $(cat "$work/why")"
    bad=1
  else
    echo "$where: is in $file"
  fi
done
if [ "$found" -eq 0 ]; then
  echo "README.md has no \`\`\`cpp block"
  bad=1
fi
exit "$bad"
