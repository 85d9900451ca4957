#!/bin/bash
# Times MuJoCo's steps and ours on the same robots in one run: run.sh FOLDER [ROUNDS]
#
# The figures go to FOLDER/figures.jsonl, one line a program, robot and round; `table.py FOLDER/figures.jsonl` makes the tables of
# BENCHMARKS.md. Nothing is installed. What it needs:
#   PYTHON          a Python with `pip install mujoco==4.0.0 numpy`   (python3)
#   PINODE_ORACLES  the folder with the robots' URDF                  (../../../../../shared/oracles)
#   CORE            the processor to run on                           (0)
set -eu
folder=${1:?usage: run.sh FOLDER [ROUNDS]}
rounds=${2:-3}
here=$(cd "$(dirname "$0")" && pwd)
python=${PYTHON:-python3}
export PINODE_ORACLES=${PINODE_ORACLES:-$here/../../../../../shared/oracles}
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
cd "$here/../../../.."
"$python" -c 'import mujoco' 2>/dev/null && mujoco=yes || { mujoco=; echo "SKIPPED MuJoCo: $python does not have it" >&2; }

cargo bench --locked -p pinode-nn --bench steps --no-run
export CRITERION_HOME=$folder/criterion
on_one_core() { taskset -c "${CORE:-0}" "$@"; }
PINODE_ENDS=$folder/ends.json on_one_core cargo bench -q --locked -p pinode-nn --bench steps -- '^none$' >/dev/null

for round in $(seq "$rounds"); do
  for robot in cartpole_roehrl2020/fixed kuka_iiwa/fixed quadruped/floating talos_reduced/fixed talos_reduced/floating four_bar/fixed window/fixed; do
    urdf=$PINODE_ORACLES/${robot%/*}.urdf
    [ -f "$urdf" ] || urdf=models/${robot%/*}/${robot%/*}.urdf
    echo "round $round, $robot, load $(cut -d ' ' -f 1 /proc/loadavg)" >&2
    case $robot in
      four_bar/* | window/*) ;; # no peer: a closed loop is no part of a URDF
      *) [ -z "$mujoco" ] || on_one_core "$python" "$here/mujoco_steps.py" "$urdf" "${robot#*/}" "$folder/ends.json" ;;
    esac
    rm -rf "$CRITERION_HOME"
    on_one_core cargo bench -q --locked -p pinode-nn --bench steps -- "^$robot/" >/dev/null 2>&1
    "$python" "$here/../../../lagrange/benches/peers/table.py" record "$CRITERION_HOME"
  done >>"$folder/figures.jsonl"
done
"$python" "$here/table.py" "$folder/figures.jsonl"
