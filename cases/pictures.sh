#!/bin/sh
# Redraws the pictures of README and docs with the program as it is now:
#   sh cases/pictures.sh              all of them: some hours, most of them the curves of error against run time
#   sh cases/pictures.sh NAME...      some: sh cases/pictures.sh rhombus-tracks paper-fig2
#   sh cases/pictures.sh --list       their names
# A picture is replaced only once the new one is there. What was computed before comes from the cache. After a change of
# the program look at each before you commit it.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
cd "$root"
bin=$root/.venv/bin
kept=docs/pictures
runs=runs/pictures
names="rhombus-film rhombus-tracks rhombus-pressure rhombus-inputs rhombus-curves labyrinth-tracks zigzag-tracks throughput
  throughput-labyrinth tracker-error-time paper-fig2 paper-fig4 paper-fig6 paper-fig7 paper-fig7-flows"

run() { "$bin/wakeflow" run "$1" --out "$runs/$2" --quiet; }
small='import sys; from PIL import Image
Image.open(sys.argv[1]).convert("RGB").quantize(128, dither=0).save(sys.argv[2], "PNG", optimize=True)'
take() { # a picture that is there, a PNG with few colours: a third of its size
  case $2 in
    *.png) "$bin/python" -c "$small" "$1" "$kept/.$2.part" ;;
    *) cp "$1" "$kept/.$2.part" ;;
  esac
  mv "$kept/.$2.part" "$kept/$2"
  echo "$kept/$2"
}

draw() {
  case $1 in
    rhombus-film)
      run cases/rhombus.toml rhombus
      "$bin/wakeflow" animate "$runs/rhombus" --out "$runs/film.gif" --quiet
      take "$runs/film.gif" "$1.gif" ;;
    rhombus-tracks | rhombus-pressure | rhombus-inputs)
      run cases/rhombus.toml rhombus
      take "$runs/rhombus/figures/${1#rhombus-}.png" "$1.png" ;;
    rhombus-curves)
      "$bin/wakeflow" verify cases/rhombus.toml
      take runs/verify/curves-rhombus.png "$1.png" ;;
    labyrinth-tracks)
      "$bin/wakeflow" run cases/labyrinth.toml --quick --out "$runs/labyrinth" --quiet # not an hour for its tracks
      take "$runs/labyrinth/figures/tracks.png" "$1.png" ;;
    zigzag-tracks)
      run cases/zigzag.toml zigzag
      take "$runs/zigzag/figures/tracks.png" "$1.png" ;;
    throughput)
      "$bin/python" tests/proofs/studies throughput "$runs/$1.png" --scene rhombus --rung draft
      take "$runs/$1.png" "$1.png" ;;
    throughput-labyrinth)
      "$bin/python" tests/proofs/studies throughput "$runs/$1.png" --scene labyrinth --rung draft
      take "$runs/$1.png" "$1.png" ;;
    tracker-error-time)
      "$bin/wakeflow" verify tracker
      take runs/verify/tracker.png "$1.png" ;;
    paper-fig7-flows)
      run cases/paper/fig7.toml fig7
      take "$runs/fig7/figures/fig7-flows.png" "$1.png" ;;
    paper-fig*)
      figure=${1#paper-}
      run "cases/paper/$figure.toml" "$figure"
      take "$runs/$figure/figures/$figure.png" "$1.png" ;;
    *)
      echo "no picture $1; there are: $(echo $names)" >&2
      exit 2 ;;
  esac
}

case ${1:-} in
  --list) echo $names | tr ' ' '\n'; exit 0 ;;
  "") set -- $names ;;
esac
sh cases/setup.sh
mkdir -p "$runs"
for name; do draw "$name"; done
