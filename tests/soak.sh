#!/usr/bin/env bash
# Runs the whole program for a given time under load, faults and attacks, and reports whether it grows.
#
#   tests/soak.sh [SECONDS]      600 without a number
#   tests/soak.sh 3600 --release     the optimized program, as on a vehicle
#
# It needs the packages that tests/run.sh installs: run that once before. Everything happens in a network
# namespace of its own, on the loopback interface. tests/soak.py describes the output.
set -euo pipefail
cd "$(dirname "$0")/.."
die() { printf 'tests/soak.sh: %s\n' "$*" >&2; exit 2; }

seconds=600 profile=debug build=()
for word in "$@"; do
    case $word in
        --release) profile=release build=(--release) ;;
        *[!0-9]* | "") die "unknown word ${word}: tests/soak.sh [SECONDS] [--release]" ;;
        *) seconds=$word ;;
    esac
done
python=$(ls -d target/tests/venv-*/bin/python 2>/dev/null | head -n 1) || true
[ -n "$python" ] || die "no virtual environment: run tests/run.sh first"
cargo build --locked --bin telltale "${build[@]}"
export TELLTALE=$PWD/target/$profile/telltale PYTHONDONTWRITEBYTECODE=1

# A namespace of its own if that is allowed; otherwise the loopback interface of this machine.
inside='ip link set lo up; ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo; exec "$@"'
if unshare --net true 2>/dev/null; then
    exec unshare --net bash -c "$inside" soak "$python" tests/soak.py "$seconds"
fi
exec "$python" tests/soak.py "$seconds"
