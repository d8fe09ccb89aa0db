#!/usr/bin/env python3
"""Steps of cd-solve compared with those of LMGC90, on one core, from the same DATBOX, in alternating runs.

    pip install numpy && pip install --no-deps compas_lmgc90==0.1.11
    cargo build --release
    python3 bench/lmgc90.py CASE H STEPS [--self-gravity] [OPTIONS OF cd-solve]

The package contains LMGC90 as a library without threads. Its procedures are called here in the order of a user's script:
theta = 0.5; polyhedra by the common plane (500 iterations, neighbour distance 0.1); nonlinear Gauss-Seidel with stored
Delassus loops, norm QM/16 at 1.666e-4, evaluated every 50 sweeps. H: step, s. With --self-gravity LMGC90 gets the
attraction that its bodies had in the first step, and the time of computing it is not counted.

Writes milliseconds a step by stage, without writing, sweeps, and the ratio of the times, into lmgc90.csv; the name of
CASE, or SCENE, is that of the rows. MACHINE and RESULTS: see bench/record.sh.
"""

import ctypes
import csv
import glob
import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

PACKAGE_VERSION = importlib.metadata.version("compas_lmgc90")
GRAVITATIONAL_CONSTANT = 6.6743e-11  # m^3 / (kg s^2)
ITERATIONS, NEIGHBOUR = 500, 0.1
NORM, TOLERANCE, RELAXATION = "QM/16", 1.666e-4, 1.0
CHECKS, SWEEPS = 500, 50

# Kinds of contact, by the contactors of candidate and antagonist.
KINDS = ["spspx", "spplx", "prprx", "prplx"]


class Fortran:
    """Procedures of Fortran modules: arguments are passed by reference, lengths of strings come last."""

    def __init__(self):
        folders = importlib.util.find_spec("compas_lmgc90").submodule_search_locations
        self.object = ctypes.CDLL(glob.glob(os.path.join(folders[0], "_lmgc90*.so"))[0])

    def procedure(self, module, name):
        return getattr(self.object, f"__{module}_MOD_{name}")

    def call(self, module, name, *arguments, gives=ctypes.c_int):
        procedure = self.procedure(module, name)
        procedure.restype = gives
        kinds = {bool: ctypes.c_int, int: ctypes.c_int, float: ctypes.c_double}
        passed = [
            ctypes.c_char_p(x.encode()) if isinstance(x, str) else ctypes.byref(kinds[type(x)](x)) if type(x) in kinds else x
            for x in arguments
        ]
        lengths = [ctypes.c_size_t(len(x)) for x in arguments if isinstance(x, str)]
        # Optional arguments are absent by a null pointer.
        return procedure(*passed, *lengths, *[None] * (0 if lengths else 6))


class Lmgc90:
    def __init__(self, case, h):
        self.fortran = Fortran()
        call = self.fortran.call
        os.chdir(case)
        os.makedirs("OUTBOX", exist_ok=True)
        call("utilities", "disable_logmes")
        call("prprx", "set_cundall_iteration_prprx", ITERATIONS)
        call("prprx", "set_cundall_neighbor_prprx", NEIGHBOUR)
        call("prprx", "set_clipper_parameters", 0.0, 0.0, 0.0)
        call("prprx", "with_nodal_contact_prprx")
        call("prprx", "set_size_factor_polyr_prprx", 10)
        call("overall", "init_dimension", "3D        ")
        call("overall", "set_time_step", h, False)
        call("overall", "init_theta_integrator", 0.5, False)
        call("bulk_behaviour", "read_in_bulk_behav")
        for name in ["open_tact_behav_ll", "open_see_ll"]:
            call("tact_behaviour", name)
        call("tact_behaviour", "read_xxx_tact_behav", 1)
        for name in ["close_tact_behav_ll", "close_see_ll"]:
            call("tact_behaviour", name)
        call("rbdy3", "read_in_bodies_rbdy3", 1)
        call("rbdy3", "update_existing_entities_rbdy3")
        call("rbdy3", "read_behaviours_rbdy3")
        call("overall", "read_in_dof_ol", 0)
        call("rbdy3", "read_in_dof_rbdy3", 0)
        call("rbdy3", "read_in_driven_dof_rbdy3", 1)
        for shape in ["spher", "planx", "polyr"]:
            call(shape, f"read_bodies_{shape}")
        call("overall", "init_entitylist")
        self.kinds = [kind for kind in KINDS if call(kind, f"check_{kind}")]
        self.numbers = [call("parameters", "get_interaction_id_from_name", kind[:4].upper() + "x") for kind in self.kinds]
        call("overall", "read_in_vloc_rloc_ol", 0)
        for kind in self.kinds:
            call(kind, f"read_ini_vloc_rloc_{kind}", 0)
        call("rbdy3", "comp_mass_rbdy3")
        for kind in self.kinds:
            if kind != "prplx":  # prplx has no boxes
                call(kind, f"compute_box_{kind}")
        self.forces = None

    def attract(self):
        call, vector = self.fortran.call, (ctypes.c_double * 6)()
        bodies = range(1, call("rbdy3", "get_nb_rbdy3") + 1)
        x, m = np.empty((len(bodies), 3)), np.empty(len(bodies))
        for i in bodies:
            call("rbdy3", "get_vector_rbdy3", "Coor_", i, vector, 6)
            x[i - 1] = vector[:3]
            m[i - 1] = call("rbdy3", "get_mass", i, gives=ctypes.c_double)
        self.forces = []
        for i in bodies:
            d = x - x[i - 1]
            r2 = (d**2).sum(axis=1)
            r2[i - 1] = np.inf
            force = GRAVITATIONAL_CONSTANT * m[i - 1] * (d * (m / r2**1.5)[:, None]).sum(axis=0)
            self.forces.append((i, (ctypes.c_double * 6)(*force)))

    def step(self):
        """Seconds by stage, contacts, sweeps, whether they converged."""
        call, clock = self.fortran.call, time.perf_counter
        begin = clock()
        call("overall", "clean_writing_flags")
        call("overall", "time_increment")
        for name in ["increment", "comp_fext", "comp_fint"]:
            call("rbdy3", f"{name}_rbdy3")
        pulled = clock()
        for i, force in self.forces or []:
            call("rbdy3", "put_vector_rbdy3", "Fext_", i, force, 6)
        begin += clock() - pulled
        call("rbdy3", "comp_free_vlocy_rbdy3")
        call("overall", "init_entitylist")
        call("overall", "set_run_contactor", 1)
        free = clock()
        for kind in self.kinds:
            call(kind, f"coor_prediction_{kind}")
            if call(kind, f"run_{kind}"):
                call(kind, f"creation_tab_visu_{kind}")
            call(kind, f"wcp_compute_contact_{kind}" if kind == "prprx" else f"compute_contact_{kind}")
        detected = clock()
        for number in self.numbers:
            call("inter_meca_handler_3d", "recup_rloc", number)
        call("nlgs_3d", "set_nlgs_parameter", NORM, TOLERANCE, RELAXATION)
        call("nlgs_3d", "prep_nlgs", True)
        sweeps, converged = self.sweep()
        call("nlgs_3d", "update_tact_behav_nlgs")
        for number in self.numbers:
            call("inter_meca_handler_3d", "stock_rloc", number)
        solved = clock()
        contacts = sum(call(kind, f"get_nb_{kind}", 0) for kind in self.kinds)
        call("rbdy3", "comp_dof_rbdy3")
        call("overall", "updt_time_begin")
        call("rbdy3", "update_dof_rbdy3")
        stages = {"detection": detected - free, "solve": solved - detected, "rest": free - begin + clock() - solved}
        return stages, contacts, sweeps, converged

    def sweep(self):
        call, left = self.fortran.call, ctypes.c_int(0)
        solve = self.fortran.procedure("nlgs_3d", "solve_nlgs")
        sweep, compare, end = [ctypes.byref(ctypes.c_int(k)) for k in (1, 2, 3)]
        sweeps = 0
        for _ in range(CHECKS):
            for _ in range(SWEEPS):
                solve(sweep)
            sweeps += SWEEPS
            call("nlgs_3d", "prep_check_nlgs", ctypes.byref(left))
            if not left.value:
                break
            solve(compare)
            call("nlgs_3d", "comp_check_nlgs", ctypes.byref(left))
            if not left.value:
                break
        call("nlgs_3d", "rnodhrloc_nlgs")
        solve(end)
        call("nlgs_3d", "nullify_entitylist_nlgs")
        return sweeps, not left.value


def hush():
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def theirs(case, h, steps, self_gravity):
    lmgc90 = Lmgc90(case, h)
    if self_gravity:
        lmgc90.attract()
    made = [lmgc90.step() for _ in range(steps)]
    stages = {stage: 1e3 * sum(step[0][stage] for step in made) / steps for stage in made[0][0]}
    contacts, sweeps, converged = [sum(step[k] for step in made) for k in (1, 2, 3)]
    return stages, contacts / steps, sweeps / steps, steps - converged


def ours(case, h, steps, options):
    program = os.environ.get("CD_SOLVE", os.path.join(os.path.dirname(__file__), "../target/release/cd-solve"))
    words = [program, case, "--force", "--threads", "1", "--dt", str(h), "--steps", str(steps), "--output-every", str(steps)]
    subprocess.run([*words, *options], check=True, stdout=subprocess.DEVNULL)
    with open(os.path.join(case, "TIMER.csv")) as timer, open(os.path.join(case, "OUTBOX/steps.csv")) as log:
        timer, log = list(csv.DictReader(timer)), list(csv.DictReader(log))

    def mean(rows, name):
        return sum(float(row[name]) for row in rows) / steps

    stages = {name: 1e3 * mean(timer, name) for name in timer[0] if name not in ("step", "writing")}
    return stages, mean(log, "contacts_listed"), mean(log, "sweeps"), sum(row["converged"] == "0" for row in log)


def main():
    case, h, steps, *options = sys.argv[1:]
    h, steps = float(h), int(steps)
    scene = os.environ.get("SCENE", os.path.basename(os.path.normpath(case)))
    with open(os.path.join(case, "DATBOX/BODIES.DAT")) as bodies:
        size = sum(line.split()[:1] == ["RBDY3"] for line in bodies)
    together, rows = [], []
    for name, program in [("LMGC90", f",compas_lmgc90 {PACKAGE_VERSION}"), ("cd-solve", "")]:
        with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(1, initializer=hush) as process:
            shutil.copytree(os.path.join(case, "DATBOX"), os.path.join(folder, "DATBOX"))
            # In a process of its own, because LMGC90 changes the folder and writes to the terminal.
            if name == "LMGC90":
                found = process.submit(theirs, folder, h, steps, "--self-gravity" in options).result()
            else:
                found = ours(folder, h, steps, options)
        stages, contacts, sweeps, unconverged = found
        together.append(sum(stages.values()))
        values = [(stage, f"{ms:.3g}", "ms a step") for stage, ms in stages.items()]
        values += [("all", f"{together[-1]:.3g}", "ms a step"), ("contacts", f"{contacts:.0f}", "")]
        values += [("sweeps a step", f"{sweeps:.1f}", ""), ("unconverged steps", f"{unconverged}", "")]
        if name == "cd-solve":
            values.append(("times as fast", f"{together[0] / together[1]:.3g}", ""))
        rows += [f"{scene},{size},{quantity},{value},{unit},1{program}" for quantity, value, unit in values]
    record = os.path.join(os.path.dirname(os.path.abspath(__file__)), "record.sh")
    subprocess.run([record, "lmgc90"], check=True, text=True, input="\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
