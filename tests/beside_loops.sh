#!/bin/sh
# Runs the tests so many times in a row beside six endless loops, until one fails: sh tests/beside_loops.sh [times]
# The loops are a session of their own, as started from another terminal.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
logs=$(mktemp -d)
setsid sh -c 'for loop in 1 2 3 4 5 6; do while :; do :; done & done; wait' &
loops=$!
trap 'kill -- "-$loops"' EXIT
trap 'exit 130' HUP INT TERM
for turn in $(seq "${1:-5}"); do
    log=$logs/$turn.log
    began=$(date +%s)
    code=0
    sh "$here/run.sh" -q >"$log" 2>&1 || code=$?
    echo "$turn: $(tail -n 1 "$log") after $(($(date +%s) - began)) s, load $(cut -d ' ' -f 1 /proc/loadavg); see $log"
    [ "$code" = 0 ] || exit "$code"
done
