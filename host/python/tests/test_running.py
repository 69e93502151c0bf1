"""The client against the program itself: a run on the simulated fingertip that serves."""

import os
import re
import subprocess

import pytest

import gripline
from gripline import client as module


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Address of a run and the file with its token."""
    token = tmp_path_factory.mktemp("running") / "token"
    command = [os.environ["GRIPLINE"], "run", "--seconds", "300", "--serve", "127.0.0.1:0", "--token-file", str(token)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        said = []
        for line in run.stderr:
            said.append(line)
            if found := re.search(r"http://([0-9.:]+)", line):
                break
        assert found, said
        yield found[1], token
        run.kill()


@pytest.fixture
def cell(running):
    address, token = running
    return gripline.Client(address, client="cell-3", token_file=token)


def test_it_is_held_and_released_and_the_status_says_so(cell):
    assert cell.hold(take_over=True)["outcome"] == "done"
    assert cell.status()["mode"] == "hold" and cell.status()["owner"] == "cell-3"
    assert cell.set_floor(3.0)["outcome"] == "done"
    released = cell.release()
    assert released["outcome"] == "done" and released["took_ms"] < 2_000
    assert cell.status()["mode"] == "released"


def test_frames_come_while_it_runs(cell):
    frames = [frame for frame, _ in zip(cell.frames(), range(5), strict=False)]
    numbers = [frame["frame"] for frame in frames]
    assert len(frames) == 5 and numbers == sorted(set(numbers))
    assert {"state", "stick_ratio", "slip_evidence", "line_n"} <= frames[0].keys()


def test_who_does_not_own_it_is_told_who_does(running, cell):
    address, token = running
    cell.hold(take_over=True)
    other = gripline.Client(address, client="desk", token_file=token)
    with pytest.raises(module.WrongOwner, match="cell-3"):
        other.release()
    assert cell.status()["mode"] == "hold"


def test_what_it_refuses_has_its_name(running, cell):
    cell.hold(take_over=True)
    with pytest.raises(module.OutOfRange):
        cell.set_floor(1_000.0)
    with pytest.raises(module.ControlError):
        cell.rezero()
    with pytest.raises(module.BadToken):
        gripline.Client(running[0], client="cell-3", token="5e" * 32).release()
    assert cell.status()["mode"] == "hold"
