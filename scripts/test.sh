#!/usr/bin/env bash
# All tests of the workspace: the core, the lab, the tool, the kernels on a GPU (a software one will do),
# the plugin in a running app, documentation examples. The examples are built. One profile and one set of
# features: nothing is built twice.
# Options go to cargo: scripts/test.sh --test repository
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scripts/setup.sh test
PATH="$PATH:${CARGO_HOME:-$HOME/.cargo}/bin"

# Mesa keeps compiled shaders here; its own choice of a place may not be writable.
export MESA_SHADER_CACHE_DIR="${MESA_SHADER_CACHE_DIR:-${CARGO_TARGET_DIR:-$PWD/target}/mesa_shader_cache}"
mkdir -p "$MESA_SHADER_CACHE_DIR"

exec cargo test --locked --workspace "$@"
