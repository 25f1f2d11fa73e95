#!/usr/bin/env bash
# Runs every test: scripts, unit, property, scenario, router, DDS with foreign peers, a real browser.
#
#   tests/run.sh             needs Rust, a C and a C++ compiler, Fast DDS, python3 with venv, sqlite3, iproute2, iptables, curl, jq,
#                            npm, prometheus, debootstrap, systemd-nspawn and systemd-analyze (as root), lintian, and Chromium
#   tests/run.sh screenshot  makes docs/screenshot.png anew instead
#   tests/run.sh screens     makes docs/screens/ anew instead
#
# TELLTALE_CRASH_ROUNDS=200 kills the program that often, not 20 times. The tests of full and
# read-only disks need mount namespaces.
#
# On Debian, as root, the script installs what is missing; otherwise it names the missing packages and runs
# nothing. Nothing is skipped: a test that did not run fails the whole run. DDS stays on the loopback
# interface. The last line is `N passed, N failed`.
set -uo pipefail
cd "$(dirname "$0")/.."
root=$PWD
work=$root/target/tests
mkdir -p "$work"

say() { printf '\n== %s\n' "$*"; }
die() { printf 'tests/run.sh: %s\n' "$*" >&2; exit 2; }

find_chromium() {
    local name
    # The shell has the same engine without the browser around it, and takes a third less of the processor.
    for name in "${CHROMIUM:-}" chromium-headless-shell chromium chromium-browser google-chrome; do
        [ -n "$name" ] && command -v "$name" && return
    done
}

has_venv() { python3 -c 'import ensurepip, venv' 2>/dev/null; }

has_header() { echo "#include <$1>" | g++ -E -x c++ - >/dev/null 2>&1; }

install_debian_packages() {
    local packages=()
    [ -n "$(find_chromium)" ] || packages+=(chromium-headless-shell)
    has_venv || packages+=(python3 python3-venv)
    command -v sqlite3 >/dev/null || packages+=(sqlite3)
    command -v ip >/dev/null || packages+=(iproute2)
    command -v iptables >/dev/null || packages+=(iptables)
    command -v debootstrap >/dev/null || packages+=(debootstrap)
    command -v dpkg-deb >/dev/null || packages+=(dpkg)
    command -v systemd-analyze >/dev/null || packages+=(systemd)
    command -v systemd-nspawn >/dev/null || packages+=(systemd-container)
    command -v lintian >/dev/null || packages+=(lintian)
    command -v curl >/dev/null || packages+=(curl)
    command -v jq >/dev/null || packages+=(jq)
    command -v g++ >/dev/null || packages+=(g++)
    has_header fastdds/dds/domain/DomainParticipant.hpp || packages+=(libfastrtps-dev)
    has_header fastcdr/Cdr.h || packages+=(libfastcdr-dev)
    command -v npm >/dev/null || packages+=(npm)
    command -v prometheus >/dev/null || packages+=(prometheus)
    [ ${#packages[@]} -gt 0 ] || return 0
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        say "installing ${packages[*]}"
        # Tests start Prometheus themselves: the service of its package would take a port of this machine.
        local policy=/usr/sbin/policy-rc.d
        if [ -e "$policy" ]; then policy=; else printf '#!/bin/sh\nexit 101\n' >"$policy" && chmod +x "$policy"; fi
        apt-get update -q >"$work/apt.log" 2>&1 &&
            DEBIAN_FRONTEND=noninteractive apt-get install -qy --no-install-recommends "${packages[@]}" \
                >>"$work/apt.log" 2>&1
        local code=$?
        [ -z "$policy" ] || rm -f "$policy"
        [ "$code" -eq 0 ] || { tail -n 20 "$work/apt.log" >&2; die "apt-get failed"; }
    else
        die "missing: ${packages[*]}. Install with: sudo apt-get install ${packages[*]}"
    fi
}

# One virtual environment for each list of requirements: a changed list makes a new one.
prepare_python() {
    local key
    key=$({ python3 -V; cat tests/requirements.txt; } | sha256sum | cut -c1-16)
    venv=$work/venv-$key
    if [ ! -e "$venv/complete" ]; then
        say "preparing python in ${venv#"$root"/}"
        rm -rf "$work"/venv-*
        python3 -m venv "$venv" &&
            "$venv/bin/pip" install -q --disable-pip-version-check --require-hashes --only-binary :all: \
                -r tests/requirements.txt &&
            touch "$venv/complete" || die "the python packages could not be installed"
    fi
}

# One library for each source, rebuilt when an included file changes.
prepare_fastdds() {
    local source=tests/dds/fastdds.cpp flags=(-std=c++17 -O1 -Wall -Wextra -shared -fPIC) key
    key=$({ g++ -dumpfullversion; echo "${flags[@]}"; g++ "${flags[@]}" -E "$source"; } | sha256sum | cut -c1-16)
    fastdds=$work/fastdds-$key.so
    if [ ! -e "$fastdds" ]; then
        say "building ${fastdds#"$root"/}"
        rm -f "$work"/fastdds-*
        g++ "${flags[@]}" "$source" -o "$fastdds.part" -lfastrtps -lfastcdr &&
            mv "$fastdds.part" "$fastdds" || die "$source does not build"
    fi
}

# `cargo deb`, and a small Debian to try the package in, of the release that this machine has: the program needs its
# C library. Both are kept for the next run.
CARGO_DEB=3.8.0
prepare_packaging() {
    local tool=$work/cargo-deb-$CARGO_DEB codename
    if [ ! -x "$tool/bin/cargo-deb" ]; then
        say "building cargo-deb $CARGO_DEB"
        rm -rf "$work"/cargo-deb-*
        CARGO_TARGET_DIR=$work/cargo-deb-build cargo install -q --locked --debug --no-default-features \
            --version "$CARGO_DEB" --root "$tool" cargo-deb || die "cargo-deb does not build"
        rm -rf "$work/cargo-deb-build"
    fi
    cargo_deb=$tool/bin/cargo-deb
    codename=$(. /etc/os-release && echo "${VERSION_CODENAME:-bookworm}")
    debian=$work/debian-$codename.tar
    if [ ! -e "$debian" ]; then
        say "preparing ${debian#"$root"/}"
        [ "$(id -u)" = 0 ] || die "the package is tried in a Debian of its own, which needs root"
        rm -rf "$work"/debian*
        debootstrap --variant=minbase --include=systemd,init-system-helpers "$codename" "$work/debian" \
            >"$work/debootstrap.log" 2>&1 && tar -C "$work/debian" -cf "$debian.part" --exclude=./proc/* \
            --exclude=./dev/* --exclude=./var/cache/apt --exclude=./usr/share/locale . &&
            mv "$debian.part" "$debian" || { tail -n 20 "$work/debootstrap.log" >&2; die "debootstrap failed"; }
        rm -rf "$work/debian"
    fi
}

# The package of the program that is tested. Its symbols are not needed, and would make it large.
pack() {
    local deb=$work/telltale.deb
    say "packing ${deb#"$root"/}"
    "$cargo_deb" --no-build --strip --fast --profile dev -q -o "$deb" >"$work/pack.log" 2>&1 ||
        { cat "$work/pack.log" >&2; die "cargo deb failed"; }
    export TELLTALE_TEST_DEB=$deb TELLTALE_TEST_DEBIAN=$debian
}

passed=0 failed=0
# count NAME PASSED FAILED: one runner's result. A runner that ran nothing has failed.
count() {
    passed=$((passed + $2)) failed=$((failed + $3))
    if [ $(($2 + $3)) -eq 0 ]; then
        echo "$1: no test ran" >&2
        failed=$((failed + 1))
    fi
}

# How long the tests of one Rust binary may take, and a single browser test in seconds: many times what they do.
RUST_LIMIT=20m BROWSER_LIMIT=600

# Adds up the results of cargo's test binaries. Ignored tests count as failed.
rust_tests() {
    say "rust: unit, property, router, DDS"
    # Tests with peers wait most of the time, and have limits of seconds: a busy machine would fail them.
    local threads
    threads=$(nproc)
    export RUST_TEST_THREADS=$((2 * threads))
    # A test that waits without end is a failure with a name; building takes as long as it takes.
    local limited="timeout --foreground --kill-after=30 $RUST_LIMIT"
    cargo test --locked --features zenoh --no-fail-fast --config "target.'cfg(unix)'.runner = '$limited'" 2>&1 | tee "$work/cargo.log"
    local code=${PIPESTATUS[0]} sums
    awk '/^test .* has been running for over/ { slow[$2] } /^test .* \.\.\. / { delete slow[$2] }
        END { for (name in slow) print "did not end: " name }' "$work/cargo.log"
    read -r -a sums < <(awk '/^test result:/ { for (i = 2; i <= NF; i++) {
            if ($i == "passed;") p += $(i - 1)
            if ($i == "failed;" || $i == "ignored;") f += $(i - 1) } }
        END { print p + 0, f + 0 }' "$work/cargo.log")
    [ "$code" -eq 0 ] || [ "${sums[1]}" -gt 0 ] || sums[1]=1
    count rust "${sums[@]}"
}

scripts() {
    say "the scripts of the pages"
    if tests/lint.sh; then count scripts 1 0; else count scripts 0 1; fi
}

scenarios() {
    say "scenarios in virtual time"
    local file good=0 bad=0
    for file in config/scenarios/*.yaml; do
        [ -e "$file" ] || continue
        if "$TELLTALE" scenario "$file"; then good=$((good + 1)); else bad=$((bad + 1)); fi
    done
    count scenarios "$good" "$bad"
}

# The real program, foreign DDS peers and a real browser. Most of these tests wait most of the time, so
# several processes run them side by side, each with DDS domains and ports of its own. Tests with limits of
# seconds (`pytest.mark.timed`) follow, a file in one process; tests that measure times close to
# their limits (`pytest.mark.alone`) run last, with nothing beside them.
browser_tests() {
    say "the whole program side by side: foreign DDS peers, real browser"
    browser_part together -m "not alone and not timed" --numprocesses 3 --dist worksteal
    say "the whole program, where limits are seconds"
    browser_part timed -m "timed and not alone" --numprocesses 3 --dist loadfile
    say "the whole program, where times are measured"
    browser_part alone -m alone --numprocesses 1
}

# browser_part NAME OPTIONS: skipped tests count as failed. A test that hangs ends its process, which says where.
browser_part() {
    local report=$work/pytest-$1.xml sums=(0 0) code
    rm -f "$report"
    "$TELLTALE_PEER_PYTHON" -m pytest -p no:cacheprovider -q --tb=short --durations=5 --junit-xml="$report" \
        -o faulthandler_timeout=$BROWSER_LIMIT -o faulthandler_exit_on_timeout=true "${@:2}" tests/browser
    code=$?
    [ ! -e "$report" ] || read -r -a sums < <("$TELLTALE_PEER_PYTHON" - "$report" <<'PY'
import sys, xml.etree.ElementTree as tree
suites = list(tree.parse(sys.argv[1]).getroot().iter("testsuite"))
total = lambda *names: sum(int(suite.get(name, 0)) for suite in suites for name in names)
bad = total("failures", "errors", "skipped")
print(max(0, total("tests") - bad), bad)
PY
    )
    [ "$code" -eq 0 ] || [ "${sums[1]}" -gt 0 ] || sums[1]=1
    count "browser, $1" "${sums[@]}"
}

case ${1:-} in
    "" | screenshot | screens) ;;
    *) die "unknown word ${1}: tests/run.sh [screenshot|screens]" ;;
esac
command -v cargo >/dev/null || die "missing: cargo. Install Rust from https://rustup.rs"
command -v cc >/dev/null || die "missing: a C compiler. Install with: sudo apt-get install gcc libc6-dev"
install_debian_packages
prepare_python
prepare_fastdds
[ -n "${1:-}" ] || prepare_packaging

export PYTHONDONTWRITEBYTECODE=1
export TELLTALE_PEER_PYTHON=$venv/bin/python
export TELLTALE_PEER_FASTDDS=$fastdds
export TELLTALE_NATS_SERVER=$venv/bin/nats-server
export TELLTALE=$root/target/debug/telltale
CHROMIUM=$(find_chromium)
export CHROMIUM

say "building"
if [ -n "${1:-}" ]; then
    cargo build --locked --features zenoh --bin telltale || die "the program does not build"
    exec "$TELLTALE_PEER_PYTHON" "tests/browser/$1.py"
fi
# The program is built with the tests: by itself it would be compiled, with half of its packages, a second time,
# because the tests ask for more features of some packages.
cargo test --locked --features zenoh --no-run || die "the program or its tests do not build"
pack
scripts
rust_tests
scenarios
browser_tests

printf '\n%d passed, %d failed\n' "$passed" "$failed"
[ "$failed" -eq 0 ]
