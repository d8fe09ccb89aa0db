#!/usr/bin/env python3
"""Self-gravity of cd-solve compared with pytreegrav, on one core and the same input, at equal measured error.

    pip install numpy pytreegrav
    cargo build --release -p cd-solve --example gravity
    python3 bench/gravity.py target/release/examples/gravity [BODIES ...]

For a uniform ball and a jittered lattice of each number of bodies: cd-solve at the requested errors 1e-2, 1e-3 and 1e-4,
then pytreegrav's tree with quadrupoles at the opening that has the same error, found by bisection. Both include building
the tree; pytreegrav is compiled beforehand; the least of five evaluations, in cd-solve their median. The error is
sqrt(sum |da|^2 / sum |a|^2) on 2000 bodies (all, if there are fewer), relative to the direct sum. Writes pytreegrav.csv;
MACHINE and RESULTS: see bench/record.sh.
"""

import os
import subprocess
import sys
import tempfile
import time

os.environ["NUMBA_NUM_THREADS"] = "1"

import numpy as np
import pytreegrav

REPEAT = 5


def ball(n, random):
    x = random.normal(size=(n, 3))
    return x / np.linalg.norm(x, axis=1)[:, None] * random.random(n)[:, None] ** (1 / 3), np.full(n, 1 / n)


def rubble(n, random):
    side = int(np.ceil((1.91 * n) ** (1 / 3))) + 2
    x = np.stack(np.meshgrid(*[np.arange(side) - side / 2] * 3), -1).reshape(-1, 3)
    x = x + 0.2 * (random.random(x.shape) - 0.5)
    x = random.permutation(x[np.argsort((x**2).sum(axis=1))[:n]])
    return x, 0.3 + 2.7 * random.random(n)


def direct(x, m, picked):
    a = np.empty((len(picked), 3))
    for k, i in enumerate(picked):
        d = x - x[i]
        r2 = (d**2).sum(axis=1)
        r2[i] = np.inf
        a[k] = (d * (m / r2**1.5)[:, None]).sum(axis=0)
    return a


def error(a, exact):
    return np.sqrt(((a - exact) ** 2).sum() / (exact**2).sum())


def ours(program, folder, name, asked):
    out = os.path.join(folder, "out.csv")
    words = [program, name, "--method", "fmm", "--error", str(asked), "--threads", "1", "--repeat", str(REPEAT)]
    printed = subprocess.run([*words, "-o", out], check=True, capture_output=True, text=True).stdout
    return np.loadtxt(out, delimiter=",", skiprows=1), float(printed.split()[1])


def theirs(x, m, theta):
    seconds = []
    for _ in range(REPEAT):
        start = time.perf_counter()
        # Point masses: a softening of 0.
        a = pytreegrav.Accel(x, m, np.zeros(len(m)), theta=theta, method="tree", quadrupole=True, parallel=False)
        seconds.append(time.perf_counter() - start)
    return a, min(seconds)


def main():
    program, sizes = sys.argv[1], [int(n) for n in sys.argv[2:]] or [8000, 100_000]
    random = np.random.default_rng(1)
    theirs(*ball(100, random), 0.5)  # compiles
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for n in sizes:
            for cloud in (ball, rubble):
                x, m = cloud(n, random)
                name = os.path.join(folder, "in.csv")
                np.savetxt(name, np.c_[x, m], delimiter=",", header="x,y,z,m", comments="", fmt="%.17g")
                picked = random.choice(n, min(n, 2000), replace=False)
                exact = direct(x, m, picked)
                for asked in (1e-2, 1e-3, 1e-4):
                    a, fast = ours(program, folder, name, asked)
                    goal = error(a[picked], exact)
                    low, high = 0.05, 1.5
                    for _ in range(6):
                        theta = (low * high) ** 0.5
                        b, slow = theirs(x, m, theta)
                        found = error(b[picked], exact)
                        low, high = (theta, high) if found < goal else (low, theta)
                        if 0.9 < found / goal < 1.1:
                            break
                    rows += [
                        f"{cloud.__name__},{n},cd-solve at {asked:.0e},{1e6 * fast / n:.3g},us per body,1",
                        f"{cloud.__name__},{n},pytreegrav at {asked:.0e},{1e6 * slow / n:.3g},us per body,1",
                        f"{cloud.__name__},{n},times as fast at {asked:.0e},{slow / fast:.0f},,1",
                    ]
    record = os.path.join(os.path.dirname(os.path.abspath(__file__)), "record.sh")
    subprocess.run([record, "pytreegrav"], check=True, text=True, input="\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
