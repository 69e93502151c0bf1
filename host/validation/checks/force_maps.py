#!/usr/bin/env python3
"""Force maps of tamaas, an independent contact solver, for the cases on standard input.

Called by `cargo xtask physics`. Installs tamaas into a virtual environment under the build folder (or the folder
given as the only argument). Reads one JSON object (cells, pitch_mm, young_mpa, poisson, friction, cases with name,
height_mm per cell, force_n, pull_n [x, y]) and writes one: name -> taxel sums of the pressure and of the shear, N.
Pressure: Polonsky and Rey's gradients on the operator without period. Shear, where a case has a pull: tamaas'
Coulomb friction in one step on its periodic operator. At Poisson's ratio one half the two do not act on each other.
"""

import json
import os
import pathlib
import subprocess
import sys
import venv

PACKAGES = ["tamaas==2.9.0", "numpy==2.2.6"]
REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
# Cells along one side of a taxel.
PER_TAXEL = 4
PRESSURE_TOLERANCE = 1e-12
SHEAR_TOLERANCE = 1e-7


def in_own_environment():
    """Runs this file again with a Python that has tamaas."""
    build = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    folder = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else build / "tamaas"
    python = folder / "bin" / "python"
    if not python.exists() or subprocess.run([python, "-c", "import tamaas"], check=False).returncode:
        venv.create(folder, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True, stdout=sys.stderr)
    environment = {**os.environ, "GRIPLINE_HAS_TAMAAS": "1"}
    return subprocess.run([python, __file__], env=environment, check=False).returncode


def taxels(traction, pitch):
    """Sums over taxels, row by row."""
    side = traction.shape[0] // PER_TAXEL
    return (traction.reshape(side, PER_TAXEL, side, PER_TAXEL).sum((1, 3)) * pitch**2).ravel().tolist()


def solve(problem, case):
    """Taxel sums: z, and x and y where the case pulls."""
    import numpy as np
    import tamaas as tm

    cells, pitch = problem["cells"], problem["pitch_mm"]
    size = cells * pitch
    # tamaas counts heights towards the solid; its first axis is our y.
    surface = -np.minimum(np.array(case["height_mm"]).reshape(cells, cells), 60.0)

    def model(kind):
        made = tm.ModelFactory.createModel(kind, [size, size], [cells, cells])
        made.E, made.nu = problem["young_mpa"], problem["poisson"]
        return made

    pressed = model(tm.model_type.basic_2d)
    tm.ModelFactory.registerNonPeriodic(pressed, "dcfft")
    solver = tm.PolonskyKeerRey(pressed, surface, PRESSURE_TOLERANCE)
    solver.setIntegralOperator("dcfft")
    solver.max_iter = 5000
    solver.solve(case["force_n"] / size**2)
    found = {"z": taxels(np.array(pressed.traction), pitch)}
    if case["pull_n"]:
        pulled = model(tm.model_type.surface_2d)
        solver = tm.PolonskyKeerTan(pulled, surface, SHEAR_TOLERANCE, problem["friction"])
        solver.max_iter = 5000
        pull_x, pull_y = case["pull_n"]
        # The components follow its axes: ours are x along columns.
        solver.solve([pull_y / size**2, pull_x / size**2, case["force_n"] / size**2])
        traction = np.array(pulled.traction)
        found["x"] = taxels(traction[..., 1], pitch)
        found["y"] = taxels(traction[..., 0], pitch)
    return found


def main():
    if "GRIPLINE_HAS_TAMAAS" not in os.environ:
        return in_own_environment()
    import tamaas as tm

    tm.set_log_level(tm.LogLevel.error)
    problem = json.load(sys.stdin)
    # tamaas prints its progress: the answer must stay alone on standard output.
    answer = os.dup(1)
    os.dup2(2, 1)
    found = {case["name"]: solve(problem, case) for case in problem["cases"]}
    with os.fdopen(answer, "w") as out:
        json.dump(found, out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
