"""Times MuJoCo's C engine on one robot: mujoco_calls.py URDF fixed|floating. Prints one line of JSON, ns of thread CPU time per call.

Shapes, contacts, limits, friction and damping are left out: what remains is the dynamics of the tree. mj_forward and mj_inverse are
called from Python, the cost of an empty call is in the line and not subtracted; mj_step runs in C many steps at a time.
"""
import json
import pathlib
import sys
import time
import xml.etree.ElementTree as xml

import mujoco
import numpy

REPEATS = 9
BATCH_NS = 20e6


def mechanics_only(path, floating):
    """The URDF's links with their inertia, its joints, and options for MuJoCo's reader."""
    robot = xml.fromstring(pathlib.Path(path).read_bytes())
    for element in list(robot):
        if element.tag not in ("link", "joint"):
            robot.remove(element)
    for link in robot.iter("link"):
        for shape in link.findall("visual") + link.findall("collision"):
            link.remove(shape)
    if floating:
        children = {child.get("link") for child in robot.iter("child")}
        root = next(link.get("name") for link in robot.iter("link") if link.get("name") not in children)
        xml.SubElement(robot, "link", name="outside")
        joint = xml.SubElement(robot, "joint", name="free", type="floating")
        xml.SubElement(joint, "parent", link="outside")
        xml.SubElement(joint, "child", link=root)
    options = xml.SubElement(xml.SubElement(robot, "mujoco"), "compiler")
    options.attrib.update(fusestatic="true", discardvisual="true", inertiafromgeom="false")
    return xml.tostring(robot, encoding="unicode")


def ns_per_call(call):
    """`call(count)` makes so many calls."""

    def batch(count):
        start = time.thread_time_ns()
        call(count)
        return time.thread_time_ns() - start

    count = 64
    while batch(count) < BATCH_NS:
        count *= 2
    return float(numpy.median([batch(count) / count for _ in range(REPEATS)]))


def free_of_constraints(model):
    """No contacts, limits, friction and damping."""
    model.dof_damping[:] = 0
    model.dof_frictionloss[:] = 0
    for flag in (mujoco.mjtDisableBit.mjDSBL_CONTACT, mujoco.mjtDisableBit.mjDSBL_CONSTRAINT):
        model.opt.disableflags |= int(flag)


def main():
    path, base = sys.argv[1:]
    model = mujoco.MjModel.from_xml_string(mechanics_only(path, base == "floating"))
    free_of_constraints(model)
    model.opt.timestep = 1e-6  # the state stays what it is

    data = mujoco.MjData(model)
    random = numpy.random.default_rng(20)
    start = data.qpos.copy()
    mujoco.mj_integratePos(model, start, random.uniform(-1, 1, model.nv), 1.0)
    velocity = random.uniform(-1, 1, model.nv)

    def repeated(function):
        def call(count):
            for _ in range(count):
                function(model, data)

        return call

    def steps(integrator):
        def call(count):
            model.opt.integrator = int(integrator)
            mujoco.mj_step(model, data, count)

        return call

    calls = {
        "mj_forward": repeated(mujoco.mj_forward),
        "mj_inverse": repeated(mujoco.mj_inverse),
        "mj_step_euler": steps(mujoco.mjtIntegrator.mjINT_EULER),
        "mj_step_rk4": steps(mujoco.mjtIntegrator.mjINT_RK4),
        "empty_call": repeated(lambda model, data: mujoco.mj_isPyramidal(model)),
    }
    line = {
        "tool": "mujoco",
        "version": mujoco.__version__,
        "robot": pathlib.Path(path).stem,
        "base": base,
        "nv": model.nv,
        "unit": "ns",
    }
    for name, call in calls.items():
        data.qpos[:], data.qvel[:] = start, velocity
        data.qacc[:] = 0
        mujoco.mj_forward(model, data)
        line[name] = round(ns_per_call(call), 1)
    print(json.dumps(line))


if __name__ == "__main__":
    main()
