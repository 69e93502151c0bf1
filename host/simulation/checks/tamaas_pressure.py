#!/usr/bin/env python3
"""Solved pressure against tamaas, an independent contact solver, on odd shapes.

Installs tamaas into a virtual environment under the build folder (or the folder given as the only argument),
runs the example `half_space_pressure` for each shape and solves the same heights with tamaas: Polonsky and
Rey on its operator without period. Exits 1 where the force maps differ by more than 3 % (L2).
"""

import os
import pathlib
import subprocess
import sys
import venv

SHAPES = ["cross", "two spheres", "wavy", "triangle", "ring"]
BOUND = 0.03
# What the example states.
CELLS, PITCH_MM, YOUNG_MPA, POISSON, FORCE_N = 80, 0.4, 0.4, 0.5, 3.0
PER_TAXEL = 4
REPOSITORY = pathlib.Path(__file__).resolve().parents[3]


def in_own_environment():
    """Runs this file again with a Python that has tamaas."""
    build = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    folder = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else build / "tamaas"
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "tamaas==2.9.0", "numpy"], check=True)
    environment = {**os.environ, "GRIPLINE_HAS_TAMAAS": "1"}
    return subprocess.run([python, __file__], env=environment, check=False).returncode


def compare(shape):
    """Relative L2 difference of the taxel sums."""
    import numpy as np
    import tamaas as tm

    command = ["cargo", "run", "--quiet", "--release", "-p", "gripline-simulation"]
    command += ["--example", "half_space_pressure", "--", shape]
    text = subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True, text=True).stdout
    height, ours = np.loadtxt(text.splitlines()).T.reshape(2, CELLS, CELLS)
    size = CELLS * PITCH_MM
    model = tm.ModelFactory.createModel(tm.model_type.basic_2d, [size, size], [CELLS, CELLS])
    model.E, model.nu = YOUNG_MPA, POISSON
    tm.ModelFactory.registerNonPeriodic(model, "dcfft")
    # tamaas counts heights towards the solid.
    solver = tm.PolonskyKeerRey(model, -np.minimum(height, 60.0), 1e-12)
    solver.setIntegralOperator("dcfft")
    solver.max_iter = 5000
    solver.solve(FORCE_N / size**2)

    def taxels(pressure):
        side = CELLS // PER_TAXEL
        return pressure.reshape(side, PER_TAXEL, side, PER_TAXEL).sum((1, 3)) * PITCH_MM**2

    theirs = taxels(np.array(model.traction))
    return np.linalg.norm(taxels(ours) - theirs) / np.linalg.norm(theirs)


def main():
    if "GRIPLINE_HAS_TAMAAS" not in os.environ:
        return in_own_environment()
    worst = 0.0
    for shape in SHAPES:
        difference = compare(shape)
        worst = max(worst, difference)
        print(f"{shape:<12} force map differs by {100 * difference:.4f} %")
    print(f"worst {100 * worst:.4f} %, bound {100 * BOUND:.0f} %")
    return 0 if worst <= BOUND else 1


if __name__ == "__main__":
    sys.exit(main())
