"""Scenes, network, recordings and samples: what the command line writes, bit for bit."""

import shutil

import matplotlib.image
import numpy as np
import pytest
from conftest import numbers, table

import gripline


def grey(path):
    """A grey PNG of 8 bits."""
    return np.rint(matplotlib.image.imread(path) * 255.0).astype(np.uint8)


@pytest.fixture(scope="module")
def frames(scene_file):
    scene = gripline.Scene(scene_file)
    assert (scene.frames, scene.fingers, scene.frames_per_second, scene.seed) == (16, 1, 20.0, 7)
    return scene, list(scene)


def test_a_scene_gives_pictures_maps_and_truth_of_the_command_line(simulated, frames):
    scene, played = frames
    assert len(played) == len(scene) == 16 and scene.unsolved == []
    maps = np.concatenate([frame["maps"] for frame in played])
    assert maps.shape == (16, 3, 20, 20) and maps.dtype == np.float32 and maps[-1, 2].sum() > 1.5
    np.testing.assert_array_equal(maps, np.load(simulated / "maps.npy"))
    truth = table(simulated / "truth.csv")
    assert list(truth) == list(played[0]["truth"])
    for name, texts in truth.items():
        found = [frame["truth"][name] for frame in played]
        if name == "phase":
            assert found == texts
        else:
            np.testing.assert_array_equal(np.array(found, dtype=float), numbers(texts))
    for number in (0, 15):
        np.testing.assert_array_equal(
            played[number]["pictures"][0], grey(simulated / "frames" / f"{number:06}.png")
        )
    np.testing.assert_array_equal(scene.rest[0], grey(simulated / "rest.png"))


def test_a_scene_without_pictures_has_the_same_truth(scene_file, frames):
    for plain, frame in zip(gripline.Scene(scene_file, pictures=False), frames[1]):
        assert plain["pictures"] is None
        np.testing.assert_array_equal(plain["maps"], frame["maps"])


def test_the_shipped_scenes_can_be_played():
    assert gripline.scenes() == ["grasp_lift_pull", "press_and_drag", "slides", "twist_stamp"]
    for name in gripline.scenes():
        scene = gripline.Scene(name, pictures=False)
        frame = next(scene)
        assert frame["maps"].shape == (scene.fingers, 3, 20, 20)
        assert frame["truth"]["frame"] == 0


def test_another_seed_is_another_noise(scene_file):
    first, other = (next(gripline.Scene(scene_file, seed=seed, size="crop"))["pictures"] for seed in (7, 8))
    assert first.shape == (1, 440, 440) and (first != other).any()


@pytest.mark.parametrize("network", ["tracked", "unet"])
def test_the_network_gives_the_maps_of_the_command_line(program, simulated, frames, tmp_path, network):
    folder, out = simulated / "frames", tmp_path / "maps.npy"
    program("infer", "--rest", simulated / "rest.png", "--frames", folder, "--out", out, "--network", network)
    scene, played = frames
    pictures = np.concatenate([frame["pictures"] for frame in played])
    found = gripline.ForceNetwork(scene.rest[0], network=network).infer(pictures)
    np.testing.assert_array_equal(found["maps"], np.load(out))
    assert found["good"].all() and set(found["health"]) == {"good"}
    assert found["maps"][-1, 2].sum() == pytest.approx(2.0, rel=0.3)
    # The crop is the same picture, in whatever order it lies and whatever is computed of it.
    cropped = np.asfortranarray(pictures[:, 20:460, 100:540])
    again = gripline.ForceNetwork(scene.rest[0, 20:460, 100:540], network=network, engine="dense")
    np.testing.assert_array_equal(again.infer(cropped)["maps"], found["maps"])


def test_a_picture_that_cannot_be_believed_is_named_and_has_a_map_of_zeros(frames):
    scene, played = frames
    pictures = np.concatenate([played[-1]["pictures"]] * 3)
    pictures[1] = 255
    found = gripline.ForceNetwork(scene.rest[0]).infer(pictures)
    assert found["good"].tolist() == [True, False, True] and "bright" in found["health"][1]
    assert not found["maps"][1].any() and found["maps"][2].any()


def test_a_fingertips_gains_scale_its_maps(frames):
    scene, played = frames
    picture = played[-1]["pictures"]
    plain = gripline.ForceNetwork(scene.rest[0]).infer(picture)["maps"]
    scaled = gripline.ForceNetwork(scene.rest[0], gain=(2.0, 0.5)).infer(picture)["maps"]
    np.testing.assert_array_equal(scaled, plain * np.array([2.0, 2.0, 0.5], np.float32)[:, None, None])
    for wrong, found in [((1.0, 0.0), "0"), ((21.0, 1.0), "21"), ((float("nan"), 1.0), "NaN")]:
        with pytest.raises(gripline.GriplineError, match=f"gain: found {found}, expected two numbers from 0.05 to 20"):
            gripline.ForceNetwork(scene.rest[0], gain=wrong)


def test_a_sensor_file_says_where_the_fingertip_is(frames, tmp_path):
    scene, played = frames
    (tmp_path / "turned.toml").write_text(SENSOR.replace('flip = "none"', 'flip = "both"'))
    turned = gripline.ForceNetwork(scene.rest[0, ::-1, ::-1], sensor=tmp_path / "turned.toml")
    plain = gripline.ForceNetwork(scene.rest[0])
    picture = played[-1]["pictures"]
    np.testing.assert_array_equal(turned.infer(picture[:, ::-1, ::-1])["maps"], plain.infer(picture)["maps"])
    with pytest.raises(gripline.GriplineError, match="gelsight-mini.1: found printed markers, expected particles"):
        gripline.ForceNetwork(scene.rest[0], sensor="gelsight-mini")


def test_pictures_of_another_size_or_type_are_refused(frames):
    rest = frames[0].rest[0]
    network = gripline.ForceNetwork(rest)
    for pictures, error, words in [
        (rest, ValueError, r"pictures: found shape \(480, 640\), expected \(T, H, W\)"),
        (np.zeros((1, 88, 88), np.uint8), ValueError, "found pictures of 88 rows and 88 columns, expected 480 and 640"),
        (np.zeros((1, 440, 440)), TypeError, "found dtype float64, expected uint8"),
        (np.zeros((1, 440, 440, 3), np.uint8), ValueError, r"found shape \(1, 440, 440, 3\)"),
    ]:
        with pytest.raises(error, match=words):
            network.infer(pictures)
    assert network.infer(np.zeros((0, 440, 440), np.uint8))["maps"].shape == (0, 3, 20, 20)


def test_a_recording_is_what_export_writes(program, recording, tmp_path):
    program("export", recording, "--out", tmp_path)
    read = gripline.read_recording(recording)
    np.testing.assert_array_equal(read["maps"], np.load(tmp_path / "maps.npy"))
    np.testing.assert_array_equal(read["pictures"], np.load(tmp_path / "pictures.npy"))
    assert read["rest"].shape[1:] == (440, 440) and len(read["rest"]) > 0
    told, columns = table(tmp_path / "frames.csv"), read["columns"]
    assert set(told) == {*columns, "sensor"}
    for name, column in columns.items():
        if column.dtype.kind == "U":
            assert column.tolist() == told[name], name
        else:
            np.testing.assert_array_equal(column.astype(float), numbers(told[name]), name)
    assert read["truncated"] is None and "friction" in read["metadata"]["settings"]
    assert gripline.read_recording(recording, pictures=False)["pictures"] is None
    with pytest.raises(gripline.GriplineError, match="found no frame of fingertip 1"):
        gripline.read_recording(recording, sensor=1)


def test_a_recording_that_was_cut_short_is_read_to_its_last_whole_frame(recording, tmp_path):
    cut = tmp_path / "cut.mcap"
    shutil.copy(recording, cut)
    with open(cut, "r+b") as file:
        file.truncate(recording.stat().st_size * 2 // 3)
    whole, read = gripline.read_recording(recording), gripline.read_recording(cut)
    count = len(read["maps"])
    assert read["truncated"] and 0 < count < len(whole["maps"])
    np.testing.assert_array_equal(read["maps"], whole["maps"][:count])


def test_samples_repeat_by_seed_and_hold_forces_that_press():
    first = gripline.TrainingSamples(5).batch(12)
    stream = gripline.TrainingSamples(5, split="train", size="crop")
    parts = [stream.batch(5), stream.batch(7)]
    for name in ("maps", "stick_ratio", "shape", "sensor", "gross_slip", "friction"):
        np.testing.assert_array_equal(np.concatenate([part[name] for part in parts]), first[name])
    assert first["rest"].shape == first["now"].shape == (12, 88, 88)
    assert parts[0]["now"].shape == (5, 440, 440)
    blocks = parts[0]["now"].reshape(5, 88, 5, 88, 5).mean(axis=(2, 4))
    np.testing.assert_array_equal(np.rint(blocks), first["now"][:5])
    touched = ~np.isnan(first["stick_ratio"])
    assert touched.sum() > 6 and (first["maps"][touched, 2].sum(axis=(1, 2)) > 0).all()
    other = gripline.TrainingSamples(5, split="test").batch(12)
    assert not set(other["sensor"].tolist()) & set(first["sensor"].tolist())


SENSOR = """
schema = 1
name = "particle-fingertip"
revision = 1
summary = "particles in a soft gel, 640x480"

[capture]
camera_px = [640, 480]
size_px = [640, 480]
rate_hz = 60.0
colour = "grey"
crop_px = [100, 20, 440, 440]
flip = "none"

[view]
field_mm = [32.0, 32.0]
zoom = [1.0, 1.0]
lens = "fisheye"

[gel]
pad_mm = [36.0, 36.0]
thickness_mm = 6.0
young_mpa = 0.4
poisson = 0.49

[markers]
kind = "volume"
polarity = "bright"
diameter_mm = [0.15, 0.18]
depth_mm = [1.0, 5.5]
count = [5000, 5000]

[taxels]
grid = [20, 20]
pitch_mm = 1.6

[health]
brightness = [0.75, 1.35]
rest_level = [15.0, 120.0]
overexposed_level = 190.0
overexposed_share = 0.2
lost_share = 0.3

[forces]
weights = "tracked"
"""
