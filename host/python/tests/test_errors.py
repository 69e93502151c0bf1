"""What is refused names what was found and what was expected."""

import os

import numpy as np
import pytest
from conftest import contact_maps

import gripline

MAPS = contact_maps(4)


@pytest.mark.parametrize(
    ("maps", "error", "words"),
    [
        (MAPS.tolist(), TypeError, ["maps: found list", "NumPy array of shape (T, 3, R, C)"]),
        (None, TypeError, ["maps: found NoneType"]),
        (MAPS[0], ValueError, ["found shape (3, 20, 20)", "expected (T, 3, R, C)"]),
        (np.float32(1), TypeError, ["found float32"]),
        (np.array(1.0), ValueError, ["found shape ()"]),
        (np.moveaxis(MAPS, 1, -1), ValueError, ["found 20 channels on axis 1, expected 3", "moveaxis"]),
        (MAPS[:, :2], ValueError, ["found 2 channels on axis 1, expected 3; give x, y and z"]),
        (np.zeros((2, 3, 21, 20), np.float32), ValueError, ["found 21 rows, expected 1 to 20"]),
        (np.zeros((2, 3, 20, 0), np.float32), ValueError, ["found 0 columns, expected 1 to 20"]),
        (MAPS.astype(np.int32), TypeError, ["found dtype int32, expected float32 or float64"]),
        (MAPS.astype(">f4"), TypeError, ["found dtype >f4, expected float32 or float64 of this machine's byte order"]),
        (MAPS.astype(np.float16), TypeError, ["found dtype float16"]),
        (MAPS.astype(object), TypeError, ["found dtype object"]),
        (np.frombuffer(b"\0" * 4801, np.uint8)[1:].view(np.float32).reshape(1, 3, 20, 20), ValueError, ["aligned"]),
    ],
)
def test_an_array_that_is_not_maps(maps, error, words):
    for judge in (gripline.Detector(), gripline.Controller()):
        with pytest.raises(error) as caught:
            judge(maps)
        assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("judge", [gripline.Detector(), gripline.Controller()])
def test_a_number_that_is_not_finite_is_named_by_frame_and_taxel(judge, number):
    maps = MAPS.copy()
    maps[2, 1, 7, 19] = number
    with pytest.raises(ValueError, match=r"in frame 2 at row 7, column 19, y; expected finite forces"):
        judge(maps)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: gripline.Detector(mu=2.1), "mu: found 2.1, expected a number from 0 to 2"),
        (lambda: gripline.Detector(mu=np.nan), "mu: found NaN"),
        (lambda: gripline.Detector(threshold=-0.1), "threshold: found -0.1, expected a number from 0 to 1"),
        (lambda: gripline.Detector(contact_min=9), "contact_min: found 9, expected a number from 0 to 8"),
        (lambda: gripline.Detector(scale=0), "scale: found 0, expected a positive number"),
        (lambda: gripline.Detector(pitch_mm=0), "pitch_mm: found 0, expected a number from 0.1 to 10"),
        (lambda: gripline.Controller(rate_hz=5), "rate_hz: found 5, expected a number from 10 to 1000"),
        (lambda: gripline.TrainingSamples(1, split="all"), "split: found 'all', expected 'train' or"),
        (lambda: gripline.TrainingSamples(1).batch(0), "count: found 0"),
        (lambda: gripline.Scene("slides", size="half"), "size: found 'half', expected 'crop' or 'full'"),
        (lambda: gripline.Scene("slides", seed=2**63), "seed: found 9223372036854775808"),
        (lambda: gripline.read_recording("x", sensor=2), "sensor: found 2, expected 0 or 1"),
    ],
)
def test_a_setting_out_of_its_range(make, words):
    with pytest.raises(ValueError) as caught:
        make()
    assert words in str(caught.value)


def test_a_file_that_is_not_there_or_is_something_else(tmp_path):
    (tmp_path / "other").write_text("no recording")
    (tmp_path / "scene.toml").write_text('kind = "press"\nseed = 1\nframes_per_second = -3\n')
    for make, words in [
        (lambda: gripline.read_recording(tmp_path / "none"), "none: No such file"),
        (lambda: gripline.read_recording(tmp_path / "other"), "expected a recording of `gripline run --record`"),
        (lambda: gripline.Scene("nowhere"), "nowhere: No such file"),
        (lambda: gripline.Scene("nowhere"), "press_and_drag"),
        (lambda: gripline.Scene(tmp_path / "scene.toml"), "scene.toml:3: frames_per_second: found -3"),
        (lambda: gripline.ForceNetwork(np.zeros((440, 440), np.uint8), weights=tmp_path / "other"), "weights"),
    ]:
        with pytest.raises(gripline.GriplineError) as caught:
            make()
        assert words in str(caught.value)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_is_told_to_make_its_own():
    controller = gripline.Controller()
    child = os.fork()
    if child == 0:
        try:
            controller(MAPS)
            os._exit(1)
        except gripline.GriplineError as error:
            os._exit(0 if "forked" in str(error) else 2)
        except BaseException:
            os._exit(3)
    assert os.waitpid(child, 0)[1] == 0
