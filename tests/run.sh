#!/bin/sh
# Sets up and runs linters, types and tests: sh tests/run.sh [options of pytest]; --slow adds the long validation
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
slow=
for option; do if [ "$option" = --slow ]; then slow=--slow; fi; done
sh "$root/cases/setup.sh" test $slow
cd "$root"
bin=$root/.venv/bin
"$bin/ruff" check src tests cases
"$bin/ruff" format --check src tests cases
"$bin/mypy"
exec "$bin/python" -m pytest -n 2 --dist worksteal --durations=15 "$@"
