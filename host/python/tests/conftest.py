"""What several tests need: the command line, short scenes and recordings, and the examples.

`cargo xtask test --all` runs these tests on the installed wheel and says in GRIPLINE where the command line is.
"""

import csv
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

PACKAGE = Path(__file__).parent.parent

SCENE = """
kind = "press"
seed = 7
frames_per_second = 20
frames = "full"

[sensor]
unit = 3

[indenter]
shape = "sphere"
radius_mm = 12.0
friction = 0.65

[[path]]
name = "press"
seconds = 0.4
press_n = 2.0
at_mm = [-1.5, 0.5]

[[path]]
name = "drag"
seconds = 0.4
at_mm = [1.5, 1.1]
"""


@pytest.fixture(scope="session")
def program():
    """Runs the command line with these arguments and returns what it printed."""
    path = os.environ.get("GRIPLINE")
    assert path, "GRIPLINE: expected the path of the program `gripline`; `cargo xtask test --all` sets it"

    def run(*arguments, code=0):
        ended = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True, timeout=300)
        assert ended.returncode == code, ended.stderr
        return ended.stdout

    return run


@pytest.fixture(scope="session")
def scene_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "short.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="session")
def simulated(program, scene_file, tmp_path_factory):
    """The folder that `gripline simulate` makes of the scene."""
    folder = tmp_path_factory.mktemp("simulated") / "out"
    program("simulate", scene_file, "--out", folder)
    return folder


@pytest.fixture(scope="session")
def recording(program, tmp_path_factory):
    """Two seconds of the scripted scene, recorded with pictures."""
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    program("run", "--unpaced", "--seconds", "2", "--record", path)
    return path


def table(path):
    """A CSV as a list of texts a column."""
    with open(path, newline="") as file:
        rows = list(csv.reader(file))
    return {name: [row[place] for row in rows[1:]] for place, name in enumerate(rows[0])}


def numbers(texts):
    """A column as it was before it was written: empty is NaN."""
    return np.array([float(text) if text else np.nan for text in texts])


def contact_maps(frames, seed=1, side=20, dtype=np.float32):
    """Random maps with contact, without, in slip and beyond 8 N."""
    random = np.random.default_rng(seed)
    maps = random.normal(0.0, 0.15, (frames, 3, side, side))
    maps[:, 2] = np.abs(maps[:, 2]) * (random.random((frames, side, side)) < 0.4)
    maps[::7] = 0.0
    maps[3::11, 0, 0, 0] = 9.5
    return maps.astype(dtype)
