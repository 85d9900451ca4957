"""Figures of the benches as tables.

table.py record CRITERION_FOLDER    what criterion has measured there, a line of JSON a robot, ns a call (the median)
table.py print FIGURES.jsonl        lagrange beside its peers: ratios, then times
table.py joints CRITERION_FOLDER    cost over the number of joints
table.py text CRITERION_FOLDER      energies as text beside the same in Rust
table.py lanes CRITERION_FOLDER     a state of eight beside one alone

Of several rounds the smallest time counts; the range of a ratio is that over the rounds.
"""
import collections
import json
import pathlib
import sys

# Column, our call, Pinocchio's, largest ratio that is aimed at.
CALLS = [
    ("inverse dynamics", "inverse_dynamics", "rnea", 0.5),
    ("bias force", "bias_force", "nle", None),
    ("gravity force", "gravity_force", "gravity", None),
    ("mass matrix", "mass_matrix", "crba", 0.8),
    ("Coriolis matrix", "coriolis_matrix", "coriolis", 0.5),
    ("M, C, G together", "M_C_G_together", "M_C_G_together", 0.5),
    ("forward dynamics", "forward_dynamics", "aba", 0.6),
    ("derivatives of inverse dynamics", "inverse_dynamics_derivatives", "rnea_derivatives", None),
    ("derivatives of forward dynamics", "forward_dynamics_derivatives", "aba_derivatives", 0.8),
    ("inverse dynamics, 8 lanes", "inverse_dynamics_lanes", "rnea", 0.25),
    ("forward dynamics, 8 lanes", "forward_dynamics_lanes", "aba", 0.25),
    ("mass matrix, 8 lanes", "mass_matrix_lanes", "crba", 0.25),
    ("energies", "energies", "energy", None),
]
# Pinocchio computes some of them in two ways, of which the second is not its default.
BETTER = {"crba": "crba_local", "aba": "aba_local"}
LANES = 8


def medians(folder):
    """{group: {function or function/value: ns}} of a folder of criterion."""
    found = collections.defaultdict(dict)
    for path in sorted(pathlib.Path(folder).rglob("new/benchmark.json")):
        bench = json.loads(path.read_text())
        estimates = json.loads(path.with_name("estimates.json").read_text())
        name = "/".join(filter(None, (bench["function_id"], bench["value_str"])))
        ns = estimates["median"]["point_estimate"]
        found[bench["group_id"]][name] = ns / LANES if name.endswith("_lanes") else ns
    return found


def record(folder):
    for group, calls in medians(folder).items():
        robot, _, base = group.partition("/")
        if base in ("fixed", "floating"):
            line = {"tool": "lagrange", "robot": robot, "base": base, "unit": "ns"}
            print(json.dumps(line | {name: round(ns, 1) for name, ns in calls.items()}))


def rows(header, lines):
    print("| " + " | ".join(header) + " |")
    print("|---" * len(header) + "|")
    for line in lines:
        print("| " + " | ".join(line) + " |")
    print()


def time(ns):
    return f"{ns:.0f}" if ns < 1e4 else f"{ns / 1e3:.1f} k" if ns < 1e6 else f"{ns / 1e6:.1f} M"


def goal(robot, call, target):
    return 0.15 if robot.startswith("cartpole") and call == "M_C_G_together" else target


def print_figures(path):
    rounds = collections.defaultdict(list)  # (tool, robot, base): lines, one a round
    for line in pathlib.Path(path).read_text().splitlines():
        line = json.loads(line)
        rounds[line["tool"], line["robot"], line["base"]].append(line)
    robots = [(robot, base) for tool, robot, base in rounds if tool == "lagrange"]

    def least(tool, robot, call):
        times = [line[call] for line in rounds[(tool, *robot)] if call in line]
        return min(times, default=None)

    def peer(robot, call):
        return least("pinocchio", robot, call)

    def ratio(robot, ours, theirs, target):
        time_ours, time_theirs = least("lagrange", robot, ours), peer(robot, theirs)
        if time_ours is None or time_theirs is None:
            return "–"
        each = [
            a[ours] / b[theirs]
            for a, b in zip(rounds[("lagrange", *robot)], rounds[("pinocchio", *robot)])
        ]
        value = time_ours / time_theirs
        text = f"{value:.2f} ({min(each):.2f}–{max(each):.2f})"
        target = goal(robot[0], ours, target)
        if value > 1:
            return f"**{text} LOSES**"
        return f"**{text} missed**" if target is not None and value > target else text

    names = [f"{robot} {base}" for robot, base in robots]
    print("ours / Pinocchio, smallest of the rounds (range of the rounds)\n")
    rows(
        ["call", "target", *names],
        [
            [label, "" if target is None else f"≤ {target}", *(ratio(r, ours, theirs, target) for r in robots)]
            for label, ours, theirs, target in CALLS
            if any(least("lagrange", r, ours) for r in robots)
        ],
    )
    print("ns a call, ours · Pinocchio's\n")

    def both(robot, ours, theirs):
        pair = least("lagrange", robot, ours), peer(robot, theirs)
        return " · ".join("–" if x is None else time(x) for x in pair)

    rows(
        ["call", *names],
        [
            [label, *(both(r, ours, theirs) for r in robots)]
            for label, ours, theirs, _ in CALLS
            if any(least("lagrange", r, ours) for r in robots)
        ],
    )
    print("Pinocchio in the bodies' axes (`Convention::LOCAL`), ns a call; in brackets ours over it\n")

    def local(robot, ours, theirs):
        pair = least("lagrange", robot, ours), peer(robot, BETTER[theirs])
        return "–" if None in pair else f"{time(pair[1])} ({pair[0] / pair[1]:.2f})"

    rows(
        ["call", *names],
        [[label, *(local(r, ours, theirs) for r in robots)] for label, ours, theirs, _ in CALLS if theirs in BETTER],
    )
    print("MuJoCo, ns a call; in brackets ours over it\n")

    def mujoco(robot, ours, theirs):
        pair = least("lagrange", robot, ours) if ours else None, least("mujoco", robot, theirs)
        if pair[1] is None:
            return "–"
        return time(pair[1]) + ("" if pair[0] is None else f" ({pair[0] / pair[1]:.2f})")

    listed = [
        ("inverse dynamics", "inverse_dynamics", "mj_inverse"),
        ("forward dynamics", "forward_dynamics", "mj_forward"),
        ("", None, "mj_step_euler"),
        ("", None, "mj_step_rk4"),
        ("", None, "empty_call"),
    ]
    rows(
        ["ours", "MuJoCo's", *names],
        [[label, f"`{theirs}`", *(mujoco(r, ours, theirs) for r in robots)] for label, ours, theirs in listed],
    )


def print_joints(folder):
    found = medians(folder)
    counts = sorted({int(name.rpartition("/")[2]) for shape in ("chain", "tree") for name in found[shape]})
    lines = []
    for shape in ("chain", "tree"):
        for call in ("inverse_dynamics", "forward_dynamics"):
            ns = [found[shape][f"{call}/{n}"] for n in counts]
            growth = (ns[-1] / ns[0]) / (counts[-1] / counts[0])
            lines.append([f"{shape}, {call}", *(f"{t / n:.0f}" for t, n in zip(ns, counts)), f"{growth:.2f}"])
    rows(["ns a joint", *map(str, counts), "last / first"], lines)


def print_lanes(folder):
    found = medians(folder)
    robots = [group for group in found if "/" in group and not group.startswith("text/")]

    def pair(robot, call):
        one, eight = found[robot].get(call), found[robot].get(f"{call}_lanes")
        if one is None or eight is None:
            return "–"
        text = f"{time(one)} · {time(eight)} ({eight / one:.2f})"
        return f"**{text}**" if eight > one else text

    calls = dict.fromkeys(name.removesuffix("_lanes") for r in robots for name in found[r] if name.endswith("_lanes"))
    rows(["call", *robots], [[call, *(pair(r, call) for r in robots)] for call in calls])


def print_text(folder):
    found = medians(folder)
    for name in sorted({group.split("/")[1] for group in found if group.startswith("text/")}):
        rust, text = found[f"text/{name}/rust"], found[f"text/{name}/text"]
        rows(
            [name, "Rust, ns", "text, ns", "text / Rust (≤ 3)"],
            [
                [call, time(rust[call]), time(text[call]), f"{text[call] / rust[call]:.2f}" + (" **missed**" if text[call] > 3 * rust[call] else "")]
                for call in rust
            ],
        )


{"record": record, "print": print_figures, "joints": print_joints, "text": print_text, "lanes": print_lanes}[sys.argv[1]](sys.argv[2])
