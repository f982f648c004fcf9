#!/usr/bin/env bash
# All training runs of RESULTS.md, one at a time on each GPU: benchmarks/evidence.sh FOLDER [STEPS [SEEDS]]. Run again,
# it resumes where it was stopped. STEPS is the number of control steps of the comparisons in millions (10), SEEDS are
# their seeds ("0 1 2").
set -euo pipefail
export out=${1:?a folder for the results}
steps=${2:-10}
seeds=${3:-0 1 2}
gpus=$(nvidia-smi -L | wc -l)
mkdir -p "$out"

train() { # folder, then options
  local folder=$out/$1
  shift
  if [ ! -e "$folder/done" ]; then
    python -m benchmarks.train_rsl_rl "$@" --out "$folder" --resume > "$folder.txt" 2>&1 < /dev/null && touch "$folder/done"
  fi
}
export -f train

# compile everything once, so that the other runs find it in the cache
train warm_reach TabletopReach-v0 --minutes 0.01
train warm_lift TabletopLift-v0 --minutes 0.01

{
  for seed in 0 1 2; do echo "reach_$seed TabletopReach-v0 --seed $seed --minutes 1.5 --every 5 --evaluate-every 10"; done
  for seed in 0 1 2; do echo "lift_$seed TabletopLift-v0 --seed $seed --minutes 4 --every 5 --evaluate-every 30"; done
  compare="--minutes 30 --million-steps $steps --evaluate-every 1000"
  for seed in $seeds; do
    for bank in 1 16 256 4096; do echo "bank_${bank}_$seed TabletopReach-v0 --seed $seed --bank $bank $compare"; done
    echo "fresh_$seed TabletopReach-v0 --seed $seed $compare"
    echo "uniform_$seed TabletopReach-v0 --seed $seed --uniform $compare"
    echo "unreachable_$seed TabletopReach-v0 --seed $seed --no-reachable $compare"
  done
} | xargs -P "$gpus" -L 1 --process-slot-var=CUDA_VISIBLE_DEVICES bash -c 'train "$@"' _

python -m benchmarks.honest_resets --layouts 100000 --out "$out/honest.jsonl"
python -m benchmarks.reset_cost --task TabletopReach-v0 --out "$out/reset_cost.json"
rm -rf "$out"/warm_*
python -m benchmarks.curves "$out" --picture "$out/training.png" | tee "$out/table.md"
