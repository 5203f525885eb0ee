#!/bin/sh
# Sets up and runs one scene: sh cases/run.sh [SCENE] [options of wakeflow run]; default cases/rhombus.toml
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
case "${1:-}" in
  "" | -*) scene=$root/cases/rhombus.toml ;;
  *) scene=$1; shift ;;
esac
extra=
grep -qs '^[[:space:]]*\[funnel\]' "$scene" && extra=funnel
sh "$root/cases/setup.sh" $extra
exec "$root/.venv/bin/wakeflow" run "$scene" "$@"
