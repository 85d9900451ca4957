"""Times MuJoCo's steps on one robot, and compares where they lead: mujoco_steps.py URDF fixed|floating ENDS.json.

Prints one line of JSON: ns of thread CPU time per mj_step with RK4, and the largest differences after a roll-out of 1 s between MuJoCo
and lagrange, with the same steps, and between each of them and itself with an eighth of the step. ENDS.json is what
`PINODE_ENDS=ENDS.json cargo bench -p pinode-nn --bench steps` writes. Shapes, contacts, limits, friction and damping are left out.
"""
import json
import pathlib
import sys

import mujoco
import numpy

sys.path.append(str(pathlib.Path(__file__).resolve().parents[3] / "lagrange" / "benches" / "peers"))
from mujoco_calls import free_of_constraints, mechanics_only, ns_per_call  # noqa: E402


def axes(quaternion):
    """The rotation matrix."""
    matrix = numpy.zeros(9)
    mujoco.mju_quat2Mat(matrix, numpy.asarray(quaternion))
    return matrix.reshape(3, 3)


class Order:
    """Our (q, v) as MuJoCo's (qpos, qvel), and back: joints by name; a floating base's linear velocity is in the world's axes there."""

    def __init__(self, model, joints, nq):
        self.nq, self.pairs = nq, []
        q = v = 0
        for name in joints:
            index = 0 if name == "base" else mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
            size = (7, 6) if name == "base" else (1, 1)
            self.pairs.append((name, q, v, model.jnt_qposadr[index], model.jnt_dofadr[index], size))
            q, v = q + size[0], v + size[1]

    def load(self, data, state):
        for name, q, v, qpos, dof, (nq, nv) in self.pairs:
            data.qpos[qpos : qpos + nq] = state[q : q + nq]
            data.qvel[dof : dof + nv] = state[self.nq + v : self.nq + v + nv]
            if name == "base":
                data.qvel[dof : dof + 3] = axes(state[q + 3 : q + 7]) @ state[self.nq + v : self.nq + v + 3]

    def state(self, data, size):
        state = numpy.zeros(size)
        for name, q, v, qpos, dof, (nq, nv) in self.pairs:
            state[q : q + nq] = data.qpos[qpos : qpos + nq]
            state[self.nq + v : self.nq + v + nv] = data.qvel[dof : dof + nv]
            if name == "base":
                turn = data.qpos[qpos + 3 : qpos + 7]
                state[self.nq + v : self.nq + v + 3] = axes(turn).T @ data.qvel[dof : dof + 3]
        return state


def main():
    path, base, ends = sys.argv[1:]
    name = f"{pathlib.Path(path).stem}/{base}"
    ours = next(end for end in json.loads(pathlib.Path(ends).read_text()) if end["robot"] == name)
    model = mujoco.MjModel.from_xml_string(mechanics_only(path, base == "floating"))
    free_of_constraints(model)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_RK4)
    data = mujoco.MjData(model)
    initial = numpy.array(ours["initial"])
    order = Order(model, ours["joints"], ours["nq"])

    def end(divided):
        model.opt.timestep = ours["step"] / divided
        mujoco.mj_resetData(model, data)
        order.load(data, initial)
        mujoco.mj_step(model, data, round(1 / ours["step"]) * divided)
        return order.state(data, len(initial))

    theirs, fine = end(1), end(8)

    def apart(a, b):
        a, b = numpy.array(a), numpy.array(b)
        if base == "floating" and a[3:7] @ b[3:7] < 0:
            b[3:7] = -b[3:7]
        return float(f"{numpy.abs(a - b).max():.3g}")

    model.opt.timestep = 1e-6  # the state stays what it is
    mujoco.mj_resetData(model, data)
    order.load(data, initial)
    step = ns_per_call(lambda count: mujoco.mj_step(model, data, count))
    line = {
        "tool": "mujoco",
        "version": mujoco.__version__,
        "robot": name.partition("/")[0],
        "base": base,
        "nv": model.nv,
        "unit": "ns",
        "mj_step_rk4": round(step, 1),
        "ours_and_theirs": apart(ours["end"], theirs),
        "fine_ours_and_theirs": apart(ours["fine"], fine),
        "error_ours": apart(ours["end"], ours["fine"]),
        "error_theirs": apart(theirs, fine),
    }
    print(json.dumps(line))


main()
