"""The tables of BENCHMARKS.md on steps: table.py FIGURES.jsonl, as run.sh writes it.

Of several rounds the smallest time counts; the range of a ratio is that over the rounds.
"""
import collections
import json
import pathlib
import sys

TARGETS = {"cartpole_roehrl2020 fixed": 0.3, "kuka_iiwa fixed": 0.6}
ADJOINT = 4.0


def rows(header, lines):
    print("| " + " | ".join(header) + " |")
    print("|---" * len(header) + "|")
    for line in lines:
        print("| " + " | ".join(line) + " |")
    print()


def time(ns):
    return f"{ns:.0f}" if ns < 1e4 else f"{ns / 1e3:.1f} k" if ns < 1e6 else f"{ns / 1e6:.2f} M"


rounds = collections.defaultdict(list)  # (tool, robot): lines, one a round
for line in pathlib.Path(sys.argv[1]).read_text().splitlines():
    line = json.loads(line)
    rounds[line["tool"], f"{line['robot']} {line['base']}"].append(line)
robots = [robot for tool, robot in rounds if tool == "lagrange"]
ours = {robot: rounds["lagrange", robot] for robot in robots}
peers = {robot: rounds["mujoco", robot] for robot in robots}


def least(lines, call):
    times = [line[call] for line in lines if call in line]
    return min(times, default=None)


def ratio(above, below, target):
    """Of two lists of times, one a round."""
    value, each = min(above) / min(below), [a / b for a, b in zip(above, below)]
    text = f"{value:.2f} ({min(each):.2f}–{max(each):.2f})"
    if target is None:
        return text if value <= 1 else f"**{text} LOSES**"
    return text if value <= target else f"**{text} missed**"


def column(robot, call, lines):
    return [line[call] for line in lines[robot] if call in line]


print("One step of RK4, ns\n")
lines = []
for robot in (robot for robot in robots if least(ours[robot], "rk4_step")):
    step, theirs = column(robot, "rk4_step", ours), column(robot, "mj_step_rk4", peers)
    dynamics = least(ours[robot], "forward_dynamics")
    lanes = least(ours[robot], "rk4_100_steps_lanes")
    lines.append(
        [
            robot,
            time(min(step)),
            "–" if dynamics is None else f"{min(step) / (4 * dynamics):.2f}",
            "–" if lanes is None else time(lanes / 100),
            time(min(theirs)) if theirs else "–",
            ratio(step, theirs, TARGETS.get(robot)) if theirs else "–",
            f"≤ {TARGETS[robot]}" if robot in TARGETS else "",
        ]
    )
rows(["robot", "ours", "over four forward dynamics", "ours in lanes, a state", "`mj_step`", "ours / MuJoCo", "target"], lines)

print("After 1 s from the same state, largest difference in an entry of (q, v)\n")
rows(
    ["robot", "ours and MuJoCo's, h = 1 ms", "the same, h/8", "our error", "MuJoCo's error"],
    [
        [robot, *(f"{peers[robot][0][key]:.1e}" for key in ("ours_and_theirs", "fine_ours_and_theirs", "error_ours", "error_theirs"))]
        for robot in robots
        if peers[robot]
    ],
)

print("Steps of the variational methods, ns\n")
rows(
    ["robot", "order 2", "order 4"],
    [
        [robot, *(time(least(ours[robot], f"variational_{order}")) for order in (2, 4))]
        for robot in robots
        if least(ours[robot], "variational_2")
    ],
)

print(f"A thousand steps of RK4 and their gradient, ns (target: {ADJOINT})\n")
rows(
    ["robot", "roll-out", "with gradient", "gradient / roll-out"],
    [
        [
            robot,
            time(least(ours[robot], "roll_out_1000")),
            time(least(ours[robot], "adjoint_1000")),
            ratio(column(robot, "adjoint_1000", ours), column(robot, "roll_out_1000", ours), ADJOINT),
        ]
        for robot in robots
        if least(ours[robot], "adjoint_1000")
    ],
)

print("The window of a fit with sensitivities, ns\n")
rows(
    ["loop of the fits", "`integrators::gradient::Sensitivity`"],
    [[time(least(ours[robot], call)) for call in ("by_the_fits", "by_sensitivity")] for robot in robots if least(ours[robot], "by_the_fits")],
)
