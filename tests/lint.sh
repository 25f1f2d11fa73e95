#!/usr/bin/env bash
# Lints the scripts of the pages (static/) with Biome. It needs npm; the first time, npm fetches Biome.
set -euo pipefail
cd "$(dirname "$0")/.."
work=target/tests/lint
if ! cmp -s tests/lint/package-lock.json "$work/installed"; then
    rm -rf "$work"
    mkdir -p "$work"
    cp tests/lint/package.json tests/lint/package-lock.json "$work/"
    (cd "$work" && npm ci --no-audit --no-fund --loglevel=error)
    cp "$work/package-lock.json" "$work/installed"
fi
exec "$work/node_modules/.bin/biome" lint --config-path=tests/lint --error-on-warnings static
