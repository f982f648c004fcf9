#!/usr/bin/env bash
# All training runs of RESULTS.md on one GPU: benchmarks/evidence.sh FOLDER. Run again, it goes on where it was stopped.
# Runs whose wall-clock counts have the GPU for themselves; the comparisons of layouts have equal numbers of steps instead,
# and run three at a time.
set -euo pipefail
out=${1:?a folder for the results}
mkdir -p "$out"

train() { # folder, then options
  local folder=$out/$1; shift
  if [ ! -e "$folder/done" ]; then
    python -m benchmarks.train_rsl_rl "$@" --out "$folder" --resume >> "$out/$(basename "$folder").log" 2>&1
    touch "$folder/done"
  fi
}

for seed in 0 1 2; do
  train "reach_$seed" TabletopReach-v0 --seed $seed --minutes 2 --evaluate-every 20
done
train lift_0 TabletopLift-v0 --seed 0 --minutes 5 --evaluate-every 60

compare=(TabletopReach-v0 --minutes 30 --million-steps 20 --evaluate-every 1000)
for seed in 0 1 2; do
  for bank in 1 16 256 4096; do echo "bank_${bank}_$seed --seed $seed --bank $bank"; done
  echo "fresh_$seed --seed $seed"
  echo "uniform_$seed --seed $seed --uniform"
  echo "unreachable_$seed --seed $seed --no-reachable"
done > "$out/comparisons.txt"
while read -r folder options; do
  while [ "$(jobs -rp | wc -l)" -ge 3 ]; do wait -n; done
  # shellcheck disable=SC2086
  train "$folder" "${compare[@]}" $options < /dev/null &
done < "$out/comparisons.txt"
wait

python -m benchmarks.honest_resets --layouts 100000 --out "$out/honest.jsonl"
python -m benchmarks.reset_cost --task TabletopReach-v0 --out "$out/reset_cost.json"
