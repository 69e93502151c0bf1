"""The package as it is installed: what an import costs, types, documentation, examples."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import PACKAGE

import gripline


def python(*arguments, cwd=None):
    ended = subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=300)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_an_import_brings_neither_numpy_nor_http():
    brought = python("-c", "import sys, gripline; print(*sys.modules)").split()
    assert "gripline._gripline" in brought
    assert not {"numpy", "http.client", "json", "gripline.client"} & set(brought)


def test_the_types_are_those_of_what_is_there(tmp_path):
    """mypy compares every name, parameter and default of the stubs with the installed package."""
    python("-m", "mypy.stubtest", "gripline._gripline", "gripline.results", "--concise", cwd=tmp_path)
    sources = PACKAGE / "python" / "gripline"
    checked = [sources / "client.py", sources / "results.py", *sorted((PACKAGE / "examples").glob("*.py"))]
    python("-m", "mypy", "--strict", "--cache-dir", tmp_path, *checked, cwd=tmp_path)


def test_everything_public_is_documented():
    for name in gripline.__all__:
        thing = getattr(gripline, name)
        if name == "__version__":
            assert re.fullmatch(r"\d+\.\d+\.\d+", thing)
            continue
        assert thing.__doc__ and len(thing.__doc__) > 20, name
        if inspect.isclass(thing):
            for method, value in vars(thing).items():
                if not method.startswith("_"):
                    assert inspect.getdoc(value), f"{name}.{method}"
    with pytest.raises(AttributeError, match="nothing"):
        gripline.nothing


def test_types_are_shipped():
    folder = Path(gripline.__file__).parent
    assert {"py.typed", "__init__.pyi", "_gripline.pyi"} <= {path.name for path in folder.iterdir()}


def test_a_recording_becomes_a_plot(recording, tmp_path):
    said = python(PACKAGE / "examples" / "recording_to_plot.py", recording, tmp_path / "plot.png")
    assert re.match(r"1\d\d frames, \d+ in SLIP", said), said
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_slip_is_found_on_ones_own_taxels(tmp_path):
    said = python(PACKAGE / "examples" / "own_taxels.py", cwd=tmp_path)
    seconds, shear_n = map(float, re.search(r"\((\d\.\d+) s\) on, at (\d\.\d+) N", said).groups())
    # It slides from 2.4 N on; the edge gives way before.
    assert 1.0 < shear_n <= 2.4 and 0.5 < seconds <= 2.0, said


def test_a_training_batch_has_the_shapes_of_the_network(tmp_path):
    said = python(PACKAGE / "examples" / "training_batch.py", cwd=tmp_path)
    assert said.startswith("input (16, 2, 88, 88) float32, target (16, 3, 20, 20) float32\n"), said
