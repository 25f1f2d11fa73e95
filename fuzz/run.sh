#!/bin/sh
# Fuzzes one target on stable Rust: `fuzz/run.sh TARGET [options of libFuzzer]`.
#
# What cargo-fuzz does on a nightly compiler, without it: the compiler of the project marks every edge
# for libFuzzer. No sanitizer is on; the package forbids `unsafe`, and what is looked for are panics,
# failed assertions, endless work and memory without bound.
set -eu

target=${1:?"which target? one of: $(ls "$(dirname "$0")/fuzz_targets" | sed 's/\.rs$//' | tr '\n' ' ')"}
shift
here=$(CDPATH='' cd -- "$(dirname -- "$0")" && pwd)
host=$(rustc -vV | sed -n 's/^host: //p')
cd "$here"

# With --target the flags hold for the program alone, not for what builds it.
RUSTFLAGS='--cfg fuzzing -C debug-assertions -C overflow-checks -C codegen-units=1
    -C passes=sancov-module
    -C llvm-args=-sanitizer-coverage-level=4
    -C llvm-args=-sanitizer-coverage-inline-8bit-counters
    -C llvm-args=-sanitizer-coverage-pc-table
    -C llvm-args=-sanitizer-coverage-trace-compares' \
    cargo build --target "$host" --bin "$target"

mkdir -p "corpus/$target" "artifacts/$target"
case $target in
    configuration) seeds="../config" ;;
    scenario) seeds="../config/scenarios" ;;
    recording) seeds="seeds/recording" ;;
    *) seeds= ;;
esac
exec "target/$host/debug/$target" "corpus/$target" $seeds -artifact_prefix="artifacts/$target/" "$@"
