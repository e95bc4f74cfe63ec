#!/usr/bin/env bash
# Bakes the Cornell box and renders it with and without indirect light, beside the reference: pictures in out/demo. Needs no GPU.
# Options go to the demo: scripts/demo.sh -o somewhere/else
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scripts/setup.sh build
PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"

if [ $# -eq 0 ]; then
    set -- -o out/demo
fi
exec cargo run --release -p meshless_gi_cli -- demo "$@"
