#!/usr/bin/env bash
# Builds the wheel of the Python package into a folder: python/wheel.sh [--portable] [FOLDER [arguments for maturin]]; the folder is
# target/wheels where none is given. It needs Rust and maturin (pip install maturin).
#
# One wheel serves Python 3.10 and every later one (abi3). On Linux it gets the oldest manylinux tag that is true of what was linked, that is,
# of the glibc of this machine. With --portable zig links against glibc 2.17 instead (manylinux2014: distributions since 2014), which
# needs zig (pip install ziglang) and builds all dependencies once more.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
portable=()
if [ "${1:-}" = --portable ]; then
  portable=(--zig --compatibility manylinux2014)
  shift
fi
folder=${1:-$here/../target/wheels}
# Where the library's own build has dependencies already, they are not built again.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$here/../target}
profile=(--release)
case " $* " in *" --profile "*) profile=() ;; esac
maturin build --locked "${profile[@]}" "${portable[@]}" --manifest-path "$here/Cargo.toml" --out "$folder" "${@:2}"
