"""Every Python block of docs/python.md and of the package's page runs, in order, as a reader would run it."""

import re

import numpy as np
import pytest
from bridge import TOKEN, Bridge
from conftest import PACKAGE, contact_maps

import gripline


@pytest.fixture
def bridge():
    bridge = Bridge()
    yield bridge
    bridge.close()


@pytest.mark.parametrize("page", [PACKAGE.parent.parent / "docs" / "python.md", PACKAGE / "README.md"])
def test_what_the_page_says_can_be_run(page, bridge, recording, scene_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "state" / "gripline").mkdir(parents=True)
    (tmp_path / "state" / "gripline" / "token").write_text(TOKEN)
    np.save("maps.npy", contact_maps(20))
    (tmp_path / "run.mcap").symlink_to(recording)
    bridge.frames = [{"frame": 0, "stick_ratio": 0.9, "line_n": 3.0}]
    scene = gripline.Scene(scene_file)
    names = {
        "maps": contact_maps(20),
        "rest": scene.rest[0],
        "pictures": np.concatenate([next(scene)["pictures"] for _ in range(3)]),
    }
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)
    assert blocks
    for block in blocks:
        # A short scene does for the shipped one, which takes a minute.
        block = block.replace('"press_and_drag"', repr(str(scene_file))).replace("127.0.0.1:9187", bridge.address)
        exec(block.replace("batch(64)", "batch(4)"), names)
    if page.name == "python.md":
        assert [request["action"] for request in bridge.requests] == ["hold", "set_floor", "release"]
