"""Of several processes that ended, the one that is named, and how."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import make_reader

from evis.supervisor.failure_cause import describe_failure, ended_by_force, first_cause


def child(name, failure=None, status=None, busy_s=0.1, where=""):
    return SimpleNamespace(
        title=name, failure=failure, exit_status=status, busy_s=busy_s, where=where,
        unannounced_exit=lambda: f"{name} died",
    )  # fmt: skip


DEAD = child("dead", status=-9)
SAID = child("said", failure=("camera", "no camera model 'evk9'"), status=1)
LOST = child("lost", failure=("relay", "its neighbour is gone (topic /cam0/events)"), status=1)
TOLD = child("told", status=143)
KILLED = child("killed", status=-15)


@pytest.mark.parametrize(
    ("failed", "cause"),
    [
        ([LOST, SAID, DEAD], DEAD),
        ([LOST, SAID], SAID),
        ([LOST], LOST),
        ([TOLD, LOST, SAID], SAID),
        ([LOST, KILLED], KILLED),
        ([TOLD], TOLD),
    ],
)
def test_who_died_without_a_word_then_who_said_something_then_who_was_told_to_end(failed, cause):
    assert first_cause(failed) is cause


def test_a_node_is_named_once():
    assert describe_failure(SAID) == "camera: no camera model 'evk9'"
    assert describe_failure(child("x", failure=("imu", "imu: /state has no body"))) == "imu: /state has no body"
    assert describe_failure(DEAD) == "dead died"


def test_one_and_several_that_were_ended_by_force():
    assert (
        ended_by_force([DEAD], 5.0, False)
        == "dead did not end in 5 s and was ended by force; its files may be incomplete"
    )
    assert ended_by_force([DEAD, SAID], 5.0, True).startswith(
        "dead, said were ended by force, as a second Ctrl-C asks; their"
    )


def test_who_is_in_one_step_is_named_before_those_that_wait_for_it():
    stuck = child("stuck", busy_s=12.7)
    assert (
        ended_by_force([DEAD, stuck, SAID], 5.0, False)
        == "stuck (in one step for 13 s) did not end in 5 s and was ended by force, and so were dead, said, which "
        "waited for it; their files may be incomplete"
    )
    sensor = child("sensor (interpolator, event_sensor)", busy_s=12.7, where="event_sensor")
    assert ended_by_force([sensor, SAID], 5.0, False).startswith(
        "sensor (interpolator, event_sensor) (in one step of event_sensor for 13 s) did not end in 5 s and was ended "
        "by force, and so was said, which waited for it;"
    )
    assert (
        ended_by_force([stuck], 5.0, True)
        == "stuck (in one step for 13 s) was ended by force, as a second Ctrl-C asks; its files may be incomplete"
    )


def test_a_bag_is_whole_where_another_node_of_the_process_cannot_be_set_up(launch, tmp_path):
    bag = tmp_path / "a.mcap"
    words = ("device:=cuda:99", "--compose", "--no-view", "--duration", "0.1", "--record", str(bag))
    code, _, err = launch(Path("spinning_disk"), *words).end()
    assert code == 1 and "there is no device 'cuda:99' here" in err
    with bag.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics.message_count == 0
