"""Detector and controller: the figures of `gripline detect`, bit for bit, from every kind of array."""

import threading

import numpy as np
import pytest
from conftest import contact_maps, numbers, table

import gripline

COLUMNS = ["frame", "fn", "fx", "fy", "ft", "mz", "contact", "stick", "stick_ratio", "coulomb_slip", "slip"]


def same(found, expected):
    np.testing.assert_array_equal(np.asarray(found, dtype=float), expected)


@pytest.mark.parametrize(
    ("maps", "settings"),
    [
        (contact_maps(60), {}),
        (contact_maps(60, seed=2, dtype=np.float64), {"mu": 0.8, "threshold": 0.7}),
        (contact_maps(40, seed=3, side=5), {"contact_min": 0.01, "scale": 0.5, "pitch_mm": 4.7}),
        (contact_maps(40, seed=4)[:, :, :3, :19], {"mu": 0.0}),
    ],
)
def test_the_figures_are_those_of_the_command_line_bit_for_bit(program, tmp_path, maps, settings):
    np.save(tmp_path / "maps.npy", maps)
    flags = [word for name, value in settings.items() for word in (f"--{name.replace('_', '-')}", value)]
    program("detect", tmp_path / "maps.npy", "--csv", tmp_path / "out.csv", "--state", "--line", *flags)
    told = table(tmp_path / "out.csv")
    assert list(told) == [*COLUMNS, "state", "slip_evidence", "line_n"]
    judged = gripline.Detector(**settings)(maps)
    assert list(judged) == [*COLUMNS, "saturated"]
    said = gripline.Controller(**settings)(maps)
    assert list(said) == [*COLUMNS, "saturated", "state", "slip_evidence", "line_n"]
    for name in COLUMNS:
        same(judged[name], numbers(told[name]))
        same(said[name], numbers(told[name]))
    assert said["state"].tolist() == told["state"]
    for name in ("slip_evidence", "line_n"):
        same(said[name], numbers(told[name]))
    # What was chosen shows something at all.
    assert judged["contact"].max() > 5 and np.isnan(judged["stick_ratio"]).any()


def test_saturated_components_are_counted():
    maps = np.zeros((3, 3, 20, 20), np.float32)
    maps[1, 2, 4, 4] = 8.1
    maps[2, :, 0, 0] = [-8.1, 100.0, 7.9]
    assert gripline.Detector()(maps)["saturated"].tolist() == [0, 1, 2]


def test_a_controller_goes_on_where_the_last_call_stopped():
    maps = contact_maps(700)
    whole = gripline.Controller()(maps)
    controller = gripline.Controller()
    parts = [controller(part) for part in np.split(maps, [1, 2, 300, 300])]
    for name, column in whole.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), column)


def test_strides_do_not_matter():
    maps = contact_maps(30)
    expected = gripline.Detector()(maps)
    packed = np.zeros(maps.shape, dtype=[("a", "i4"), ("n", "f4"), ("b", "f8")])
    packed["n"] = maps
    moved = np.moveaxis(np.ascontiguousarray(np.moveaxis(maps, 1, -1)), -1, 1)
    for same_maps in (
        np.asfortranarray(maps),
        np.repeat(maps, 2, axis=0)[::2],
        maps[::-1, :, ::-1, ::-1].copy()[::-1, :, ::-1, ::-1],
        moved,
        packed["n"],
        maps.astype(np.float64),
    ):
        for name, column in gripline.Detector()(same_maps).items():
            np.testing.assert_array_equal(column, expected[name])
    spread = np.broadcast_to(maps[5], (4, 3, 20, 20))
    assert gripline.Detector()(spread)["fn"].tolist() == [expected["fn"][5]] * 4
    read_only = maps.copy()
    read_only.flags.writeable = False
    same(gripline.Detector()(read_only)["fn"], expected["fn"])


def test_no_frame_gives_empty_columns():
    for judge in (gripline.Detector(), gripline.Controller()):
        assert all(len(column) == 0 for column in judge(np.zeros((0, 3, 20, 20), np.float32)).values())


def test_other_threads_run_while_maps_are_judged():
    maps = np.broadcast_to(contact_maps(1, seed=9), (100_000, 3, 20, 20))
    thread = threading.Thread(target=gripline.Detector(), args=(maps,))
    turns = 0
    thread.start()
    while thread.is_alive():
        turns += 1
        thread.join(0.001)
    # With the interpreter's lock held, this thread would get a turn before and one after.
    assert turns > 10


def test_threads_may_share_a_controller():
    maps = contact_maps(200)
    controller = gripline.Controller()
    frames = []
    threads = [threading.Thread(target=lambda: frames.append(controller(maps)["frame"])) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(frames) == 4
    assert gripline.Controller.__call__(controller, maps[:1])["frame"].tolist() == [800]
