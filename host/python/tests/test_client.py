"""The client against a bridge that follows the contract."""

import pytest
from bridge import TOKEN, Bridge

import gripline
from gripline import client as module


@pytest.fixture
def bridge():
    bridge = Bridge()
    yield bridge
    bridge.close()


@pytest.fixture
def cell(bridge):
    return gripline.Client(bridge.address, client="cell-3", token=TOKEN)


def test_every_action_is_asked_for_as_the_contract_says(bridge, cell):
    assert cell.hold()["outcome"] == "done" and bridge.mode == "hold"
    assert cell.set_floor(4)["action"] == "set_floor" and bridge.floor_n == 4.0
    cell.acknowledge()
    cell.rezero()
    cell.release(take_over=True)
    assert bridge.mode == "released"
    assert cell.take_over()["owner"] == "cell-3"
    assert cell.yield_()["owner"] is None
    actions = ["hold", "set_floor", "acknowledge", "rezero", "release", "take_over", "yield"]
    assert [request["action"] for request in bridge.requests] == actions
    keys = [sorted(request.keys() - {"client", "request", "action"}) for request in bridge.requests]
    assert keys == [[], ["floor_n"], [], [], ["take_over"], [], []]
    numbers = [request["request"] for request in bridge.requests]
    assert numbers == sorted(set(numbers)) and numbers[0] > 1_600_000_000_000_000


def test_numbers_of_a_new_client_are_new(bridge, cell):
    cell.hold()
    gripline.Client(bridge.address, client="cell-3", token=TOKEN).hold()
    assert len(bridge.requests) == 2


def test_status_and_frames_need_no_token(bridge):
    reader = gripline.Client(f"http://{bridge.address}/")
    assert reader.status() == bridge.status()
    bridge.frames = [{"frame": number, "state": "STICK"} for number in range(5)]
    bridge.half_line = b'{"frame": 5, "sta'
    assert list(reader.frames()) == bridge.frames
    for frame in reader.frames():
        assert frame == bridge.frames[0]
        break


def test_the_one_who_asks_first_owns_the_gripper(bridge, cell):
    other = gripline.Client(bridge.address, client="desk", token=TOKEN)
    cell.hold()
    with pytest.raises(module.WrongOwner) as caught:
        other.release()
    assert caught.value.owner == "cell-3" and bridge.mode == "hold"
    other.release(take_over=True)
    assert bridge.owner == "desk" and bridge.mode == "released"


REASONS = [
    ("wrong_owner", module.WrongOwner),
    ("latched", module.Latched),
    ("inhibited", module.Inhibited),
    ("link_lost", module.LinkLost),
    ("not_confirmed", module.NotConfirmed),
    ("restarted", module.Restarted),
    ("holding", module.Holding),
    ("touched", module.Touched),
    ("still_active", module.StillActive),
    ("out_of_range", module.OutOfRange),
    ("refused", module.Refused),
    ("overtaken", module.Overtaken),
    ("no_camera", module.NoCamera),
    ("busy", module.Busy),
    ("ended", module.Ended),
    ("a_new_reason", module.ControlError),
]


@pytest.mark.parametrize(("why", "error"), REASONS)
def test_every_reason_has_its_name(bridge, cell, why, error):
    bridge.refuse = [why]
    with pytest.raises(gripline.ControlError) as caught:
        cell.hold()
    assert type(caught.value) is error and caught.value.why == why
    assert str(caught.value) == f"found {why}, expected otherwise" and caught.value.answer["client"] == "cell-3"
    assert isinstance(caught.value, gripline.GriplineError) and len(bridge.requests) == 1


def test_an_answer_that_is_lost_is_asked_for_again_under_the_same_number(bridge, cell):
    bridge.lose = 1
    assert cell.release()["outcome"] == "done"
    assert len(bridge.requests) == 1
    bridge.lose = 2
    with pytest.raises(module.Unreachable):
        cell.hold()
    assert len(bridge.requests) == 2


def test_a_token_that_is_wrong_missing_or_empty(bridge, tmp_path, monkeypatch):
    with pytest.raises(module.BadToken, match="found another token") as caught:
        gripline.Client(bridge.address, token="00").hold()
    assert caught.value.why == "bad_token"
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    cell = gripline.Client(bridge.address)
    with pytest.raises(module.NoToken, match="No such file"):
        cell.hold()
    path = tmp_path / "gripline" / "token"
    path.parent.mkdir()
    path.write_text("\n")
    with pytest.raises(module.NoToken, match="found no token"):
        cell.hold()
    path.write_text(TOKEN + "\n")
    assert module.token_path() == path and cell.hold()["outcome"] == "done"
    assert gripline.Client(bridge.address, client="python", token_file=path).release()["outcome"] == "done"
    with pytest.raises(module.NoToken):
        gripline.Client(bridge.address, token="two\r\nwords").hold()
    assert len(bridge.requests) == 2


def test_a_bridge_that_is_not_there_or_is_something_else(bridge):
    gone = Bridge()
    gone.close()
    with pytest.raises(module.Unreachable, match="expected a running bridge"):
        gripline.Client(gone.address, token=TOKEN).hold()
    with pytest.raises(module.Unreachable):
        gripline.Client(gone.address).status()
    with pytest.raises(module.Unreachable):
        next(gripline.Client(gone.address).frames())
    bridge.frames = [["no", "object"]]
    with pytest.raises(gripline.ControlError, match="no JSON object"):
        list(gripline.Client(bridge.address).frames())


def test_proxies_do_not_see_the_token(bridge, monkeypatch):
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    assert gripline.Client(bridge.address, token=TOKEN).hold()["outcome"] == "done"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: gripline.Client("127.0.0.1"), "address: found '127.0.0.1', expected HOST:PORT"),
        (lambda: gripline.Client("https://127.0.0.1:1"), "address: found 'https://127.0.0.1:1'"),
        (lambda: gripline.Client("127.0.0.1:port"), "address: found '127.0.0.1:port'"),
        (lambda: gripline.Client("a:1", client="two words"), "client: found 'two words'"),
        (lambda: gripline.Client("a:1", client="c" * 65), "expected 1 to 64"),
        (lambda: gripline.Client("a:1", timeout_s=0), "timeout_s: found 0"),
        (lambda: gripline.Client("a:1", token=TOKEN).set_floor(float("nan")), "floor_n: found nan"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_sent(make, words):
    with pytest.raises(ValueError, match="found") as caught:
        make()
    assert words in str(caught.value)
