#!/bin/bash
# Times Pinocchio (C++), MuJoCo and lagrange on the same robots in one run: run.sh FOLDER [ROUNDS]
#
# In every round a robot is timed by one after the other, so that what slows the machine slows all of them. The figures go to
# FOLDER/figures.jsonl, one line a program, robot and round; `table.py print FOLDER/figures.jsonl` makes the tables of BENCHMARKS.md.
#
# Nothing is installed. What it needs:
#   PYTHON          a Python with `pip install pin==4.1.0 mujoco==4.0.0 numpy`            (python3)
#   PINODE_ORACLES  the folder with the robots' URDF                                      (../../../../../shared/oracles)
#   CORE            the processor to run on                                               (0)
#   g++, Eigen 3.4 and the headers of urdfdom: `apt-get install g++ libeigen3-dev liburdfdom-headers-dev`
# The C++ program is compiled once, in about 5 minutes; without Pinocchio or MuJoCo its part is left out.
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

pinocchio=$folder/pinocchio
prefix=$("$python" -c 'import sysconfig; print(sysconfig.get_paths()["purelib"])')/cmeel.prefix
if [ ! -x "$pinocchio" ] && [ -d "$prefix/include/pinocchio" ]; then
  # The wheel's libraries are compiled without AVX: the alignment has to stay what it is there.
  wheel="-DEIGEN_MAX_ALIGN_BYTES=16 -DEIGEN_MAX_STATIC_ALIGN_BYTES=16 -DEIGEN_MALLOC_ALREADY_ALIGNED=1
    -DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
    -DBOOST_FUSION_INVOKE_MAX_ARITY=12 -DPINOCCHIO_WITH_URDFDOM"
  # shellcheck disable=SC2086
  g++ -std=c++17 -O3 -march=native -DNDEBUG -w $wheel -I"$prefix/include" -I"$prefix/include/pinocchio/deprecated" \
    -I/usr/include/eigen3 "$here/pinocchio.cpp" -o "$pinocchio" -L"$prefix/lib" -Wl,-rpath,"$prefix/lib" \
    -lpinocchio_parsers -lpinocchio_default -lurdfdom_model -lconsole_bridge
fi
[ -x "$pinocchio" ] || echo "SKIPPED Pinocchio: no $prefix/include/pinocchio; PYTHON names the Python that has pin" >&2
"$python" -c 'import mujoco' 2>/dev/null && mujoco=yes || { mujoco=; echo "SKIPPED MuJoCo: $python does not have it" >&2; }

cargo bench --locked -p lagrange --bench robots --no-run
export CRITERION_HOME=$folder/criterion
on_one_core() { taskset -c "${CORE:-0}" "$@"; }

for round in $(seq "$rounds"); do
  for robot in cartpole_roehrl2020/fixed kuka_iiwa/fixed solo12/fixed solo12/floating talos_reduced/fixed talos_reduced/floating; do
    urdf=$PINODE_ORACLES/${robot%/*}.urdf
    echo "round $round, $robot, load $(cut -d ' ' -f 1 /proc/loadavg)" >&2
    if [ -x "$pinocchio" ]; then on_one_core "$pinocchio" "$urdf" "${robot#*/}" 2>/dev/null; fi
    if [ -n "$mujoco" ]; then on_one_core "$python" "$here/mujoco_calls.py" "$urdf" "${robot#*/}"; fi
    rm -rf "$CRITERION_HOME"
    on_one_core cargo bench -q --locked -p lagrange --bench robots -- "^$robot/" >/dev/null 2>&1
    "$python" "$here/table.py" record "$CRITERION_HOME"
  done >>"$folder/figures.jsonl"
done
"$python" "$here/table.py" print "$folder/figures.jsonl"
