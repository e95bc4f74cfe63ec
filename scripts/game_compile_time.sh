#!/usr/bin/env bash
# Prints the time that the packages of this repository take to compile in an empty Bevy game (dev
# profile), and the number of packages of the game. An argument is the folder of another version:
# scripts/game_compile_time.sh path/to/another/checkout
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
checkout="$(cd "${1:-$here}" && pwd)"
game="${TMPDIR:-/tmp}/meshless_gi_empty_game"
export CARGO_TARGET_DIR="${CARGO_TARGET_DIR:-$game/target}"
mkdir -p "$game/src"
cp "$here/Cargo.lock" "$game/"
echo "fn main() {}" > "$game/src/main.rs"
cat > "$game/Cargo.toml" <<TOML
[package]
name = "empty_game"
version = "0.1.0"
edition = "2024"

[dependencies]
bevy = { version = "0.19", default-features = false, features = ["default_app", "std", "bevy_winit", "x11", "multi_threaded", "3d_bevy_render", "scene"] }
bevy_meshless_gi = { path = "$checkout" }

[profile.dev]
debug = false
incremental = false

[workspace]
TOML
cd "$game"
cargo build --quiet
for packages in "bevy_meshless_gi" "bevy_meshless_gi meshless_gi"; do
    names=()
    for package in $packages; do
        if cargo pkgid "$package" > /dev/null 2>&1; then
            names+=(-p "$package")
        fi
    done
    cargo clean --quiet "${names[@]}"
    echo "$packages:"
    # The last report of timings in `target/cargo-timings` has both packages.
    time cargo build --quiet --timings
done
tree() {
    cargo tree --edges normal --prefix none --no-dedupe "$@" | awk '{ print $1, $2 }' | sort -u
}
echo "$(tree | wc -l) packages, of which $(comm -23 <(tree) <(tree -p bevy) | grep -vc empty_game) are not among Bevy's"
