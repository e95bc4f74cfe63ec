#!/usr/bin/env bash
# Compares the bakes of two tools, section by section:
# scripts/compare_bakes.sh OTHER_TOOL [BAKE_OPTION …]
# Bakes the scenes of tests/data and the built-in statue of points at preset `Draft` by all
# transport methods with the tool of this checkout and with OTHER_TOOL, which writes the same
# version of the format, and prints the sections that differ, and the facts of `inspect` (estimates,
# energy, counts). A change without an effect on bakes changes neither. Texts of recipe, version and
# fingerprint are left out.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
other="$(realpath "$1")"
shift
cargo build --quiet --package meshless_gi_cli
own="${CARGO_TARGET_DIR:-target}/debug/meshless_gi"
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
# Prints the facts of a bake, and digest and name of each section: facts TOOL FILE SCENE METHOD [BAKE_OPTION …]
facts() {
    if ! "$1" bake "$3" -o "$folder/$2" --preset draft --transport "$4" "${@:5}" > "$folder/log.txt" 2>&1; then
        cat "$folder/log.txt" >&2
        exit 1
    fi
    # Keys are sorted, so that `info` is before `sections`. The first section has the same texts.
    "$own" inspect "$folder/$2" --json | awk '
        /"(bytes|version|bake_version|fingerprint|recipe|given_recipe)":/ { next }
        /"sections":/ { sections = 1 }
        !sections { print }
        /"digest":/ { digest = $2 }
        /"name":/ && sections++ > 1 { print digest, $0 }'
}
"$own" scatter -o "$folder/statue.ply" > /dev/null
same=0 bakes=0
for scene in tests/data/*/*.glb "$folder/statue.ply"; do
    for method in bounded l08 pca fmm; do
        bakes=$((bakes + 1))
        facts "$other" other.mgi "$scene" "$method" "$@" > "$folder/other.txt"
        facts "$own" own.mgi "$scene" "$method" "$@" > "$folder/own.txt"
        if [ -s "$folder/own.txt" ] && diff "$folder/other.txt" "$folder/own.txt"; then
            same=$((same + 1))
        else
            echo "differs: $scene, $method" >&2
        fi
    done
done
echo "$same of $bakes bakes are equal"
[ "$same" = "$bakes" ]
