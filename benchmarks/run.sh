#!/usr/bin/env bash
# Measures rates, audits, relations and the bytes of SB3VecEnv on one device, and saves the results: run.sh DEVICE
# FOLDER [LAYOUTS], from the repository's root. DEVICE is cpu or cuda:0; LAYOUTS is the number of layouts an audit
# checks (20000). Benches run one after another, then the audits (one core each, with code that imports nothing from the
# generator) in parallel. What takes longer is not included: reach (python -m benchmarks.reach), training and resets
# (benchmarks/evidence.sh). The other rows of RESULTS.md are measured by the commands next to them.
set -uo pipefail
device=$1 folder=$2 layouts=${3:-20000}
mkdir -p "$folder"
scenes="mid mid_16k hard hard_plus table_top kitchen clutter drawer_pick"
worlds="mid:4096 mid:16384 mid:65536 mid_16k:4096 mid_16k:16384 hard:16384 hard_plus:16384 table_top:16384 kitchen:4096
  clutter:4096 drawer_pick:4096"
[ "$device" = cpu ] && worlds="mid:4096 mid_16k:1024 hard:1024 hard_plus:1024 table_top:1024 kitchen:256 clutter:256"
cli() { python3 -m sceniris_gym "$@" --device "$device" --json 2>>"$folder/errors.log"; }

python3 - <<'PY' | tee "$folder/versions.txt"
from importlib.metadata import version
print({p: version(p) for p in ("warp-lang", "mujoco", "mujoco-warp", "gymnasium", "torch", "python-fcl")})
PY
[ "$device" = cpu ] || nvidia-smi --query-gpu=name,driver_version --format=csv,noheader | tee -a "$folder/versions.txt"
for pair in $worlds; do
  cli bench "${pair%%:*}" --num-envs "${pair##*:}" | tee -a "$folder/bench.jsonl"
done
for scene in $scenes; do
  cli audit "$scene" --layouts "$layouts" --rejected "$layouts" >"$folder/audit_$scene.json" &
done
cli audit mid --layouts "$layouts" --rejected 0 --set objects.apple.ratio_on_support=1 \
  --set objects.banana.ratio_on_support=1 >"$folder/audit_mid_on_support.json" &
wait
cat "$folder"/audit_*.json
python3 -m tests.stress.relations --layouts "$((5 * layouts))" --device "$device" | tee "$folder/relations.txt"
python3 -m benchmarks.sb3_bytes --env-id sceniris_gym/DrawerPick-v0 --steps 6 --episode 5 --device "$device" \
  2>>"$folder/errors.log" | tee "$folder/sb3_bytes.jsonl"
