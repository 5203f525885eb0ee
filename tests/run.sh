#!/bin/sh
# Sets up and runs linters, types and the tests of tests/unit: sh tests/run.sh [options of pytest]. A file that has not
# changed, nor anything that it reads, since it passed is left out (tests/unchanged.py). --all runs every file, and
# tests/proofs and tests/reliability; --slow does the same and adds the long validation
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
slow= folders=
for option; do
    case $option in
        --slow) slow=--slow folders=tests ;;
        --all) folders=tests ;;
    esac
done
sh "$root/cases/setup.sh" test $slow
cd "$root"
bin=$root/.venv/bin
export WAKEFLOW_TEST_CACHE="${WAKEFLOW_TEST_CACHE:-$root/runs/.test-cache}"
# Compiled once, beside the linters, for both workers: each would compile them for itself
compiling=
trap 'test -z "$compiling" || kill $compiling 2>/dev/null' EXIT
for kernel in tracker slab; do
    "$bin/python" -c "from wakeflow.flight.stages import compilation; compilation.compile_$kernel()" &
    compiling="$compiling $!"
done
"$bin/python" -m compileall -q src  # many tests start Python, perhaps where it is told to write no bytecode
"$bin/ruff" check src tests cases
"$bin/ruff" format --check src tests cases
"$bin/mypy"
"$bin/python" tests/measure.py --hold
for child in $compiling; do wait "$child"; done
compiling=
exec "$bin/python" -m pytest -n 2 --dist worksteal --durations=15 "$@" $folders
