#!/usr/bin/env bash
# Make the training runs of TRAININGS.md: benchmarks/evidence.sh FOLDER [PART]
#
# PART is one of
#   figures  one run on each GPU: does training on fresh layouts reach its target in time?
#   curves   four runs on each GPU: banks of layouts, fresh ones and uniform placement, after equal numbers of steps.
#            DrawerPick has no runs of uniform placement, as hardly anything is ever rejected there.
#   resets   what resets cost, and whether any starts in contact or explodes
#   keep     an archive of what tables and picture need of the runs that are done. An archive with runs of other
#            sources, or with runs that FOLDER lacks, is left alone. A new folder of the same sources starts from the
#            archive, so another machine can go on.
#   all      figures, curves and resets; the default
# Each part ends with the tables and the picture. Stop the script at any time, and its runs stop with it; start it again,
# and they resume. A folder that is in use is refused, and so are results of other sources, steps, worlds or layouts. The
# exit status is 1 if a run failed or something was refused.
#
# From the environment: CUDA_VISIBLE_DEVICES, the GPUs to use (all); PER_GPU (4); ASKED (half, or whole for the longer
# comparison); and KEPT, the archive (benchmarks/training_runs.tar.xz, or training_runs_whole.tar.xz). For small trials:
# DEVICE (cuda:0), WORLDS (4096), LAYOUTS (4096), SEEDS ("0 1 2"), and STEPS, millions of steps for every task.
set -euo pipefail
export out=${1:?a folder for the results}
part=${2:-all}
case $part in
  figures | curves | resets | keep | all) ;;
  *)
    echo "There is no part '$part'. Give figures, curves, resets, keep or all." >&2
    exit 2
    ;;
esac
export device=${DEVICE:-cuda:0}
there=$({ nvidia-smi -L 2> /dev/null || true; } | wc -l)
export cards=${CUDA_VISIBLE_DEVICES:-$(seq -s , 0 $((there > 0 ? there - 1 : 0)))}
gpus=$(tr , '\n' <<< "$cards" | wc -l)
export gpus
common="--num-envs ${WORLDS:-4096} --layouts ${LAYOUTS:-4096} --device $device"
seeds=${SEEDS:-0 1 2}

# Millions of control steps in the comparisons, fixed before their first run. Those of `half` are about those after
# which a pilot on fresh layouts first passed half of what is asked of its task. ClutterPush passed 45% after 5.2 and
# ClutterExtract 40% after 17.0, in episodes of training; DrawerPick passed 40% between 7.9 and 13.1, and TabletopLift
# between 7.9 (31.5%) and 14.4 (67.2%), in evaluations.
#
# After these steps one of three seeds on fresh layouts hardly held the peg of ClutterExtract up yet. So `whole` goes on
# to those after which its pilot first passed all that is asked (80.4% of an evaluation after 24.9). It was added when
# the results of `half` were known.
asked=${ASKED:-half}
case $asked in
  half)
    declare -A steps=([ClutterExtract-v0]=17 [ClutterPush-v0]=5.2 [TabletopLift-v0]=10 [DrawerPick-v0]=13)
    archive=training_runs.tar.xz
    ;;
  whole)
    declare -A steps=([ClutterExtract-v0]=24.9)
    archive=training_runs_whole.tar.xz
    ;;
  *)
    echo "ASKED is '$asked'. Give half or whole." >&2
    exit 2
    ;;
esac
kept=${KEPT:-benchmarks/$archive}

benchmarks=$(cat benchmarks/{honest_resets,reset_cost}.py | sha256sum | cut -c -16)
sources="$(python -m sceniris_gym.training.settings) benchmarks $benchmarks worlds ${WORLDS:-4096} layouts ${LAYOUTS:-4096}"
for task in $(printf '%s\n' "${!steps[@]}" | sort); do
  sources+=" $task ${STEPS:-${steps[$task]}}"
done
mkdir -p "$out"
exec 9> "$out/lock" # runs inherit it
if ! flock -n 9; then
  echo "$out is in use: its runs are still going. Stop them, or give another folder." >&2
  exit 1
fi
kept_is_ours() { [ "$(tar -xJOf "$kept" sources)" = "$sources" ]; }
if [ ! -e "$out/sources" ] && [ -e "$kept" ]; then
  if kept_is_ours; then
    tar -xJf "$kept" -C "$out"
  else
    echo "$kept has runs of other sources: none is taken over." >&2
  fi
fi
[ -e "$out/sources" ] || echo "$sources" > "$out/sources"
rm -f "$out/failed"
if [ "$(cat "$out/sources")" != "$sources" ]; then
  echo "$out has results of other sources ($(cat "$out/sources"), now $sources). Give another folder." >&2
  exit 1
fi

train() { # a slot, a folder, then options
  local card folder=$out/$2
  card=$(cut -d , -f $(($1 % gpus + 1)) <<< "$cards")
  shift 2
  [ -e "$folder/done" ] && return
  CUDA_VISIBLE_DEVICES=$card python -m sceniris_gym train "$@" --out "$folder" --resume \
    > "$folder.txt" 2>&1 < /dev/null && touch "$folder/done"
}
export -f train

# A run that fails is reported, and starts again the next time.
run() { # how many at a time on each GPU, a function that prints a line for each run
  "$2" > "$out/lines"
  # a process group of its own, which is stopped as a whole
  setsid xargs -a "$out/lines" -P "$(($1 * gpus))" -L 1 --process-slot-var=SLOT \
    bash -c 'train "$SLOT" "$@" || { echo "failed: $1, see its .txt" >&2; touch "$out/failed"; }' _ &
  workers=$!
  wait "$workers"
  workers=
}

stop() {
  trap '' INT TERM
  [ -z "${workers:-}" ] || kill -TERM -- "-$workers" 2> /dev/null || true
  exit "$1"
}
trap 'stop 130' INT
trap 'stop 143' TERM

figures() {
  echo "figure_extract_0 ClutterExtract-v0 --minutes 20 $common"
  echo "figure_drawer_0 DrawerPick-v0 --minutes 15 $common"
  echo "figure_push_0 ClutterPush-v0 --minutes 10 $common"
}

compare() { # a task, then kinds: fresh, uniform, or the size of a bank
  local task=$1 kind option seed name
  shift
  name=$(echo "${task%-v0}" | tr '[:upper:]' '[:lower:]')
  for seed in $seeds; do
    for kind in "$@"; do
      case $kind in
        fresh) option="" ;;
        uniform) option="--uniform" ;;
        *) option="--bank $kind" ;;
      esac
      echo "${name}_${kind}_$seed $task --seed $seed $option --minutes 600 --evaluate-every 1000000 $common" \
        "--million-steps ${STEPS:-${steps[$task]}}"
    done
  done
}

curves() {
  if [ "$asked" = whole ]; then
    compare ClutterExtract-v0 16 256 fresh
    return
  fi
  compare ClutterExtract-v0 16 256 fresh uniform
  compare ClutterPush-v0 16 256 fresh uniform
  compare TabletopLift-v0 16 fresh
  compare DrawerPick-v0 16 fresh
  compare TabletopLift-v0 uniform
  compare ClutterExtract-v0 1 4096 65536
}

keep() {
  local folder files=(sources)
  if [ -e "$kept" ] && ! kept_is_ours; then
    echo "$kept keeps runs of other sources. Name another file in KEPT." >&2
    exit 1
  fi
  for folder in $([ ! -e "$kept" ] || tar -tJf "$kept" | sed -n 's,/done$,,p'); do
    if [ ! -e "$out/$folder/done" ]; then
      echo "$kept keeps $folder, which $out does not have. Name another file in KEPT." >&2
      exit 1
    fi
  done
  for folder in $(cd "$out" && find . -mindepth 2 -maxdepth 2 -name "done" -printf '%P\n' | sort | xargs -r dirname); do
    files+=("$folder"/{config.json,log.jsonl,judged.json,done})
  done
  tar -cJf "$kept.new" -C "$out" "${files[@]}"
  mv "$kept.new" "$kept"
}

case $part in figures | all) run 1 figures ;; esac
case $part in curves | all) run "${PER_GPU:-4}" curves ;; esac
case $part in
  resets | all)
    python -m benchmarks.honest_resets --layouts 100000 --out "$out/honest.jsonl"
    python -m benchmarks.reset_cost --task TabletopReachEasy-v0 --out "$out/reset_cost.json"
    ;;
esac
case $part in keep) keep ;; esac
python -m benchmarks.curves "$out" --picture "$out/training.png" | tee "$out/table.md"
if [ -e "$out/failed" ]; then
  exit 1
fi
