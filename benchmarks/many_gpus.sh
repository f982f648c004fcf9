#!/usr/bin/env bash
# Measure training and data sets on 1, 2, 4 and 8 GPUs of this host: benchmarks/many_gpus.sh FOLDER [LAYOUTS [WHERE]].
#
# FOLDER gets a JSON file of each measurement, many_gpus.json with all of them, and a plot. LAYOUTS are those of a data
# set of `mid` (100,000,000, which take 12 GB in WHERE, by default a temporary folder that is removed at the end). A tenth
# of them is made by one process as well, and by all GPUs with one process killed half-way and then resumed: the rows are
# to be the same.
set -euo pipefail
folder=$1 layouts=${2:-100000000} where=${3:-}
if [ -z "$where" ]; then
  where=$(mktemp -d)
  trap 'rm -rf "$where"' EXIT
fi
gpus=$(nvidia-smi --list-gpus | wc -l)
few=$((layouts / 10))
mkdir -p "$folder"

run() { # PROCESSES MODULE ARGUMENT...
  torchrun --standalone --nproc-per-node "$1" -m "${@:2}"
}
seconds() { # COMMAND...: print the seconds that it takes
  local start
  start=$(date +%s.%N)
  "$@" >&2
  python3 -c "print(round($(date +%s.%N) - $start, 2))"
}
generate() { # NAME PROCESSES LAYOUTS ARGUMENT...: the rate leaves out what a data set of 1,000 layouts takes
  local start made
  start=$(seconds run "$2" sceniris_gym generate mid -n 1000 --out "$where/start_$1" --json)
  made=$(seconds run "$2" sceniris_gym generate mid -n "$3" --out "$where/$1" --json "${@:4}")
  python3 -c "import json; print(json.dumps({'processes': $2, 'layouts': $3, 'seconds': $made, 'start': $start, \
'layouts_per_second': round($3 / ($made - $start))}))" | tee "$folder/generated_$1.json"
}

for number in 1 2 4 8; do
  [ "$number" -le "$gpus" ] && [ ! -s "$folder/trained_$number.json" ] && run "$number" benchmarks.many_gpus measure --folder "$folder"
done
generate one 1 "$few"
generate all "$gpus" "$layouts"
run "$gpus" sceniris_gym generate mid -n "$few" --out "$where/killed" >/dev/null 2>&1 &
launcher=$!
until [ "$(find "$where/killed/.progress" -name '*.json' 2>/dev/null | wc -l)" -gt $((few / 131072)) ]; do sleep 0.2; done
pkill -9 -f -n "sceniris_gym generate mid -n $few" || true
wait "$launcher" || true
generate killed "$gpus" "$few" --resume
python3 -m benchmarks.many_gpus same-parts --one "$where/one" --other "$where/killed"
python3 -m benchmarks.many_gpus report --folder "$folder"
