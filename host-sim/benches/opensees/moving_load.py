"""A train of constant forces over a beam, by OpenSeesPy: what an engineer would write for it, without interaction.

Reads the task as JSON on standard input:

    length_m, elements, bending_stiffness_nm2, mass_kgpm, damping_ratio    the simply supported beam
    speed_mps, wheels: [[behind_m, load_n], ..]                            the train
    step_s, steps                                                          Newmark's average acceleration

Writes JSON to standard output: the version, the seconds a step of each way to run the analysis (the best of several
repetitions), and the displacement of mid-span after each step, m, positive up.

The loads of a wheel between two nodes are the forces and moments of the beam's Hermite shapes. They are known before the
analysis begins, so the first two ways hand them to OpenSees as time series and let it run through all steps in one call,
out of Python's reach; the third sets them anew for each step, as examples of moving loads commonly do.
"""

import json
import math
import sys
import time

import openseespy.opensees as ops

REPETITIONS = 5


def nodal_loads(task):
    """For each step, {node: [force, moment]}."""
    element_m = task["length_m"] / task["elements"]
    history = []
    for step in range(1, task["steps"] + 1):
        loads = {}
        for behind_m, load_n in task["wheels"]:
            x = task["speed_mps"] * step * task["step_s"] - behind_m
            if not 0.0 <= x <= task["length_m"]:
                continue
            element = min(int(x / element_m), task["elements"] - 1)
            s = x / element_m - element
            shapes = [
                1 - 3 * s**2 + 2 * s**3,
                element_m * s * (1 - s) ** 2,
                3 * s**2 - 2 * s**3,
                element_m * s**2 * (s - 1),
            ]
            for end in range(2):
                node = loads.setdefault(element + 1 + end, [0.0, 0.0])
                for dof in range(2):
                    node[dof] -= load_n * shapes[2 * end + dof]
        history.append(loads)
    return history


def beam(task):
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    count = task["elements"]
    for node in range(count + 1):
        ops.node(node + 1, task["length_m"] * node / count, 0.0)
    ops.fix(1, 1, 1, 0)
    ops.fix(count + 1, 0, 1, 0)
    ops.geomTransf("Linear", 1)
    for element in range(1, count + 1):
        area, modulus = 1.0, 2.1e11
        second_moment = task["bending_stiffness_nm2"] / modulus
        ops.element(
            "elasticBeamColumn", element, element, element + 1, area, modulus, second_moment, 1,
            "-mass", task["mass_kgpm"], "-cMass",
        )  # fmt: skip
    w1, w2 = (math.sqrt(value) for value in ops.eigen(2))
    # The same ratio at both modes.
    xi = task["damping_ratio"]
    ops.rayleigh(2 * xi * w1 * w2 / (w1 + w2), 2 * xi / (w1 + w2), 0.0, 0.0)
    return w1 / (2 * math.pi)


def analysis(*algorithm):
    ops.wipeAnalysis()
    ops.constraints("Plain")
    ops.numberer("RCM")
    ops.system("BandSPD")
    ops.algorithm(*algorithm)
    ops.integrator("Newmark", 0.5, 0.25)
    ops.analysis("Transient")


def load_by_series(task, history):
    """A time series and a pattern for each loaded freedom."""
    tag = 0
    for node in range(1, task["elements"] + 2):
        for dof in range(2):
            values = [0.0] + [loads.get(node, (0.0, 0.0))[dof] for loads in history] + [0.0]
            if not any(values):
                continue
            tag += 1
            ops.timeSeries("Path", tag, "-dt", task["step_s"], "-values", *values)
            ops.pattern("Plain", tag, tag)
            ops.load(node, *([0.0, 1.0, 0.0] if dof == 0 else [0.0, 0.0, 1.0]))


def load_now(loads):
    """The loads of one step, in place of those of the one before."""
    ops.remove("loadPattern", 1)
    ops.pattern("Plain", 1, 1)
    for node, (force, moment) in loads.items():
        ops.load(node, 0.0, force, moment)


def by_series(task, history, *algorithm):
    """Seconds a step, all steps in one call."""
    beam(task)
    load_by_series(task, history)
    analysis(*algorithm)
    start = time.perf_counter()
    if ops.analyze(task["steps"], task["step_s"]) != 0:
        raise RuntimeError("OpenSees did not solve the steps")
    return (time.perf_counter() - start) / task["steps"]


def by_step(task, history):
    """Seconds a step, the loads set anew for each."""
    beam(task)
    ops.timeSeries("Constant", 1)
    ops.pattern("Plain", 1, 1)
    analysis("Linear")
    start = time.perf_counter()
    for loads in history:
        load_now(loads)
        if ops.analyze(1, task["step_s"]) != 0:
            raise RuntimeError("OpenSees did not solve a step")
    return (time.perf_counter() - start) / task["steps"]


def mid_span(task, history):
    """The displacement of mid-span after each step."""
    beam(task)
    load_by_series(task, history)
    analysis("Linear")
    middle = task["elements"] // 2 + 1
    displacement_m = []
    for _ in history:
        ops.analyze(1, task["step_s"])
        displacement_m.append(ops.nodeDisp(middle, 2))
    return displacement_m


def main():
    task = json.load(sys.stdin)
    history = nodal_loads(task)
    ways = {
        "one call, factorised once": lambda: by_series(task, history, "Linear", "-factorOnce"),
        "one call": lambda: by_series(task, history, "Linear"),
        "a call a step": lambda: by_step(task, history),
    }
    json.dump(
        {
            "version": ops.version(),
            "python": sys.version.split()[0],
            "first_hz": beam(task),
            "seconds_a_step": {name: min(way() for _ in range(REPETITIONS)) for name, way in ways.items()},
            "mid_span_m": mid_span(task, history),
        },
        sys.stdout,
    )


if __name__ == "__main__":
    main()
