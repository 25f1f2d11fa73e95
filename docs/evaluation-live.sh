#!/bin/sh
# Draws the live figure of docs/evaluation.md: `telltale serve` and `telltale sim` as two processes,
# over DDS on the loopback interface, and what `serve` recorded while a fault was there. It takes
# about a minute and needs nothing else on DDS domain 91. Without TELLTALE it builds the program
# first; the first argument is the file to draw.
set -eu
cd "$(dirname "$0")/.."
out=${1:-docs/figures/live-sensor-outage.svg}
telltale=${TELLTALE:-}
if [ -z "$telltale" ]; then
    cargo build --quiet
    telltale=target/debug/telltale
fi
data=$(mktemp -d)
stop() {
    kill "$serve" "$sim" 2>/dev/null || true
    wait
    rm -rf "$data"
}
trap stop EXIT
"$telltale" serve --config config/shuttle.yaml --data "$data" --interface loopback --domain 91 \
    --listen 127.0.0.1:0 >"$data/serve.log" 2>&1 &
serve=$!
# It leaves its first stop by itself; then the LiDAR is silent for three seconds.
begin=$(date -u +%s)
"$telltale" sim --config config/shuttle.yaml --interface loopback --domain 91 --drive \
    --fault sensor_outage@35..38 >"$data/sim.log" 2>&1 &
sim=$!
sleep 50
# The simulation notes in its log when it took the fault.
at=$(sed -n 's/.*\(20[0-9-]*T[0-9:.]*Z\).*fault sensor_outage: .*/\1/p' "$data/sim.log" | head -1)
if [ -z "$at" ]; then
    echo "the simulation injected no fault $(($(date -u +%s) - begin)) s after its start:" >&2
    cat "$data/sim.log" >&2
    exit 1
fi
"$telltale" history --data "$data" --at "$at" --before 2s --after 10s --figure "$out" \
    --title "live over DDS: sensor outage" --event "LiDAR falls silent" \
    --node sensors --node sensors/velodyne_packet_alive \
    --node localization --node localization/tf_quality --node localization/tf_map --node localization/scan_matching \
    --node perception --node perception/costmap_delay --signal active
echo "$out: injected at $at"
