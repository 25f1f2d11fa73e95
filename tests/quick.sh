#!/usr/bin/env bash
# The tests of every change: format, clippy, unit tests, scenarios, integration tests that need no other DDS program, scripts.
# It installs nothing. tests/run.sh runs everything.
set -euo pipefail
cd "$(dirname "$0")/.."
# The same random cases each time, as in .ci/run; tests/run.sh takes new ones.
export PROPTEST_RNG_SEED=${PROPTEST_RNG_SEED-20261122}
cargo fmt --all --check
cargo clippy --locked --all-targets --quiet -- -D warnings
cargo test --locked --quiet --lib
# Those that need the programs of tests/run.sh.
others=(cyclone:: fast_dds:: dds:: book::commands driving:: first_configuration::the_file_of_a_foreign_robot goals::a_goal_that_is_no_pose
    network:: recording_files::a_recording_is_read_by recording_schemas:: source_messages::)
cargo test --locked --quiet --test it -- "${others[@]/#/--skip=}"
for file in config/scenarios/*.yaml; do target/debug/telltale scenario "$file" >/dev/null || { echo "failed: $file" >&2; exit 1; }; done
if command -v npm >/dev/null; then tests/lint.sh; else echo "npm is missing: the scripts of the pages were not linted" >&2; fi
