#!/usr/bin/env bash
# The tests of every change: format, clippy, unit tests with the scenarios, integration tests that need no other DDS
# program, scripts. It installs nothing, says how long each part took, and ends at the first that fails.
#
#   tests/quick.sh           everything
#   tests/quick.sh PACKAGE   clippy and the tests of one package, such as telltale-web
#
# Left to tests/run.sh: what needs foreign DDS programs, the pages of docs/ that are followed to the letter, the browser and the
# package; and nine of ten random cases of the properties.
set -euo pipefail
cd "$(dirname "$0")/.."
# The same random cases each time, as in .ci/run; tests/run.sh takes new ones.
export PROPTEST_RNG_SEED=${PROPTEST_RNG_SEED-20261122} PROPTEST_CASES=${PROPTEST_CASES-200}
# Tests wait most of the time, as in tests/run.sh.
cores=$(nproc)
export RUST_TEST_THREADS=${RUST_TEST_THREADS-$((cores < 3 ? 8 : 4 * cores))}
# Those that need the programs of tests/run.sh.
others=(cyclone:: fast_dds:: dds:: book::commands driving:: evaluation_campaign::where_dds_is_not_heard fleet_export:: first_configuration::the_file_of_a_foreign_robot live::a_file_is_compared_with_a_foreign_robot goals::a_goal_that_is_no_pose
    network:: recording_files::a_recording_is_read_by recording_schemas:: source_messages::)

# part NAME COMMAND: says how long it took.
part() {
    local start=$SECONDS
    "${@:2}"
    printf '%4d s  %s\n' $((SECONDS - start)) "$1"
}

part format cargo fmt --all --check
if [ $# -gt 0 ]; then
    part clippy cargo clippy --locked --package "$1" --all-targets --quiet -- -D warnings
    # The integration tests of the program need other programs.
    [ "$1" = telltale ] && kind=--lib || kind=--tests
    part tests cargo test --locked --package "$1" $kind --quiet
    exit
fi
part clippy cargo clippy --locked --all-targets --quiet -- -D warnings
# Built at once: what both kinds of tests need is compiled side by side.
part build cargo test --locked --quiet --lib --test http --test it --no-run
# Side by side, because some of both kinds keep one core busy for long.
both() {
    local log failed=0
    log=$(mktemp)
    cargo test --locked --quiet --lib --test http >"$log" 2>&1 &
    cargo test --locked --quiet --test it -- "${others[@]/#/--skip=}" || failed=1
    wait $! || { failed=1; cat "$log" >&2; }
    rm "$log"
    return $failed
}
part "unit and integration tests" both
if command -v npm >/dev/null; then part scripts tests/lint.sh; else echo "npm is missing: the scripts of the pages were not linted" >&2; fi
printf '%4d s  in all\n' "$SECONDS"
