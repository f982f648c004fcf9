#!/usr/bin/env bash
# Measure the figures of RESULTS.md on one device: benchmarks/run.sh DEVICE FOLDER [LAYOUTS], from the repository's root.
#
# DEVICE is cpu or cuda:0; LAYOUTS is the number of layouts that each audit checks (20000). Every measurement leaves its
# lines of JSON in FOLDER/NAME.jsonl. Those that are there already are not made again, so a run that was stopped goes on;
# delete FOLDER for a new one. `python -m benchmarks.results FOLDER` then writes the page. Times come first, one after
# another and alone; what tells no time follows side by side. COMMIT names the sources where there is no git, and BEFORE
# the root of an earlier tree, whose rates and resets are measured beside these. Trainings are made by evidence.sh, and
# need hours.
set -uo pipefail
device=$1 folder=$2 layouts=${3:-20000}
mkdir -p "$folder"

measure() { # NAME COMMAND...
  local out=$folder/$1.jsonl
  shift
  [ -s "$out" ] && return
  if "$@" 2>>"$folder/errors.log" >"$out.tmp"; then mv "$out.tmp" "$out"; else echo "failed: $*" >&2; fi
}
cli() { python3 -m sceniris_gym "$@" --json; }
audit() { # FILE SCENE COUNTS [--set ...]: the device makes layouts once, and any machine judges them
  local file=$1 scene=$2 counts=$3
  shift 3
  [ -s "$file" ] || cli audit "$scene" $counts "$@" --save "$file" --device "$device" >&2 || return
  cli audit "$scene" "$@" --load "$file" || [ $? -eq 1 ]  # a bad verdict is a figure, too
}
list() { python3 -c "from benchmarks import figures; print(*figures.$1)"; }

worlds=$(list "GPU_RATES+figures.WATCHED" | tr " " "\n" | sort -u) tasks=$(list TASKS) paper="--peer uniform --peer scene_synthesizer"
[ "$device" = cpu ] && worlds=$(list CPU_RATES) tasks="" paper=--quick

measure about python3 -m benchmarks.machine "$device" "${COMMIT:-$(git describe --always --dirty --abbrev=7)}"
measure rates python3 -m benchmarks.generator_rates $worlds --device "$device"
[ "$device" = cpu ] || python3 -m benchmarks.rates "$folder/rates.jsonl" # what is slower than it ever was
measure start python3 -m benchmarks.second_start TabletopReach-v0 --device "$device" --repeats 3
measure sb3_bytes python3 -m benchmarks.sb3_bytes --env-id sceniris_gym/DrawerPick-v0 --steps 6 --episode 5 \
  --device "$device"
for task in $tasks; do
  measure "steps_$task" python3 -m benchmarks.reset_cost --task "$task" --sources fresh replayed fixed \
    --instances 2 --steps 25 --out "$folder/steps_$task.json"
done
[ -z "${BEFORE:-}" ] ||
  measure resets python3 -m benchmarks.resets_table "$folder/resets" --device "$device" --before "$BEFORE"
[ "$device" = cpu ] || measure reset python3 -m benchmarks.reset_step mid --arm --device "$device"
measure paper python3 -m benchmarks.paper $paper --device "$device" --json
measure reach python3 -m benchmarks.reach --n 6000 --device "$device"
for scene in $(list SCENES); do
  measure "audit_$scene" audit "$folder/$scene.npz" "$scene" "-n $layouts --rejected $layouts" &
done
measure audit_mid_on_support audit "$folder/mid_on_support.npz" mid "-n $layouts --rejected 0" \
  --set objects.apple.ratio_on_support=1 --set objects.banana.ratio_on_support=1 &
measure relations python3 -m tests.stress.relations --layouts "$((5 * layouts))" --device "$device" &
[ "$device" = cpu ] || measure contacts python3 -m benchmarks.honest_resets --layouts "$layouts" \
  --out "$folder/contacts.out" --device "$device" &
wait
