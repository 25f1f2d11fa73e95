#!/bin/sh
# Draws the figures of docs/evaluation.md. Without TELLTALE it builds the program first; the first
# argument is the folder to draw into.
set -eu
cd "$(dirname "$0")/.."
out=${1:-docs/figures}
telltale=${TELLTALE:-}
if [ -z "$telltale" ]; then
    cargo build --quiet
    telltale=target/debug/telltale
fi
mkdir -p "$out"
scenarios=config/scenarios
for number in 1 2 3 4 5 6; do
    set -- "$scenarios/$number"-*.yaml
    "$telltale" scenario --figure "$out/scenario-$number.svg" "$1"
done
"$telltale" scenario --figure "$out/paper-fig-6.svg" "$scenarios"/[1-6]-*.yaml >/dev/null
for name in second-fault re-attribution combine-any transitive-masking; do
    "$telltale" scenario --figure "$out/$name.svg" "$scenarios/$name.yaml"
done
