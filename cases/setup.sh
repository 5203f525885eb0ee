#!/bin/sh
# Sets up what wakeflow needs on Debian 12 or 13: packages by apt, Python packages in .venv. Does only what is missing.
#   sh cases/setup.sh          to run scenes
#   sh cases/setup.sh funnel   to run scenes with a [funnel] table as well
#   sh cases/setup.sh test     to run the tests as well (with the funnel's)
#   sh cases/setup.sh test --slow   and those that open the report in a browser
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
extra=${1:-}
venv=$root/.venv

# OpenFOAM, and the compiler of the function that Debian 13's lacks; what Gmsh's wheel links to; what VTK needs to draw
# without a screen.
packages="openfoam tcc python3 python3-venv ca-certificates
  libglu1-mesa libgl1 libxrender1 libxcursor1 libxft2 libxinerama1 libgomp1
  libegl1 libgl1-mesa-dri"

# 140 MB, and optional: without it the tests that need it are skipped
if [ "$extra" = funnel ] || { [ "$extra" = test ] && [ "$(id -u)" = 0 ]; }; then packages="$packages liggghts"; fi

# 300 MB: without it the tests that open a page are skipped
if [ "$extra" = test ] && [ "${2:-}" = --slow ] && [ "$(id -u)" = 0 ]; then packages="$packages chromium"; fi

say() { echo "setup: $*" >&2; }
fail() { say "$*"; exit 3; }

# One set-up at a time: a second one waits, and then finds everything in place.
if command -v flock >/dev/null && touch "$root/.setup.lock" 2>/dev/null; then
  exec 9>>"$root/.setup.lock"
  flock -n 9 || { say "another set-up is at work here; waiting for it to end"; flock 9; }
fi

missing=
for package in $packages; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
if [ -n "$missing" ]; then
  command -v apt-get >/dev/null || fail "needs Debian's apt-get, or these installed by other means:$missing"
  [ "$(id -u)" = 0 ] || fail "not root: run once as root: apt-get update && apt-get install -y --no-install-recommends$missing"
  say "installing$missing"
  log=$(mktemp)
  export DEBIAN_FRONTEND=noninteractive
  # Without the lock: a daemon that a package starts would keep it.
  { apt-get update && apt-get install -y --no-install-recommends $missing; } >"$log" 2>&1 9>&- || {
    tail -n 3 "$log" >&2
    fail "apt-get failed (is there a network?); whole log: $log"
  }
  rm -f "$log"
fi

python=${PYTHON:-/usr/bin/python3}
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
  fail "$python is older than 3.11; name a newer one: PYTHON=/path/to/python3 sh cases/setup.sh"
# One whose making was cut short has a python without pip.
"$venv/bin/python" -m pip --version >/dev/null 2>&1 || { rm -rf "$venv"; "$python" -m venv "$venv"; }

# Installed again only when pyproject.toml, the place of this folder or the wish for the test tools has changed.
want="$(cat "$root/pyproject.toml" "$root/requirements.lock" | sha256sum) $root"
have=$(cat "$venv/.wakeflow" 2>/dev/null || true)
case "$have" in
  "test $want") ;;
  "run $want") [ "$extra" != test ] || have= ;;
  *) have= ;;
esac
if [ -z "$have" ]; then
  target="$root[dxf,search,notebook,page]"; level=run
  [ "$extra" = test ] && { target="$root[test]"; level=test; }
  say "installing Python packages into .venv (a few minutes the first time)"
  install() { "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-warn-script-location "$@"; }
  # The versions that the tests passed with; others within pyproject's bounds where these cannot be had
  install --constraint "$root/requirements.lock" -e "$target" ||
    { say "the versions of requirements.lock cannot be had here; taking others"; install -e "$target"; } ||
    fail "pip failed (is there a network?); try again: sh cases/setup.sh $extra"
  echo "$level $want" >"$venv/.wakeflow"
fi

# The tests compile beside the linters (tests/run.sh).
[ "$extra" = test ] || "$venv/bin/python" -c "from wakeflow.flight.stages import compilation; compilation.compile_ahead()" ||
  say "the tracker could not be compiled now; the first run will do it"
