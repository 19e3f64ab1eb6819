"""Who speaks, who is lost, who is judged by, and when that ends a run."""

from types import SimpleNamespace

import pytest

from bench.control.attendance import SILENT_S, Attendance
from drivers.base.errors import DeviceSilent, LinkLost

ALL_SILENT_S = 60.0


def unit(name, role="gyro", heard_s=0.0, interval_s=0.0):
    return SimpleNamespace(
        name=name, role=role, heard_s=heard_s, interval_s=interval_s, gone=False, silent=False
    )


@pytest.fixture
def watched():
    told, invalid = [], []
    return SimpleNamespace(
        by=lambda tests, *last_s: Attendance(
            tests,
            lambda alarm: told.append((alarm.device, alarm.text)),
            lambda reason: invalid.append(reason.text),
            *last_s,
        ),
        told=told,
        invalid=invalid,
    )


GONE = LinkLost("the port is gone", where="fog_1", found="end of stream")


def test_a_unit_of_another_role_does_not_keep_a_run_alive(watched):
    platform, monitor = unit("ins", "platform"), unit("fog_1")
    attendance = watched.by("platform")
    attendance.lose(platform, 900.0, GONE)
    monitor.heard_s = platform.heard_s + ALL_SILENT_S
    attendance.check([platform, monitor], ALL_SILENT_S - 0.1)
    with pytest.raises(LinkLost, match="no platform is left") as lost:
        attendance.check([platform, monitor], ALL_SILENT_S)
    assert "ins was lost at 900.0 s" in str(lost.value)
    platform.gone = False
    with pytest.raises(DeviceSilent, match="no platform"):
        watched.by("platform").check([platform, monitor], ALL_SILENT_S)


def test_the_last_loss_names_all_that_were_lost(watched):
    first, second = unit("fog_1"), unit("can_1")
    attendance = watched.by("gyro")
    attendance.lose(first, 10.0, GONE)
    assert watched.invalid == ["fog_1 was lost at 10.0 s (the port is gone: end of stream)"]
    attendance.lose(second, 20.0, GONE)
    with pytest.raises(LinkLost) as lost:
        attendance.check([first, second], ALL_SILENT_S)
    assert "fog_1 was lost at 10.0 s" in str(lost.value) and "can_1 was lost at 20.0 s" in str(lost.value)


def test_a_unit_that_is_back_is_told_and_its_silence_counts_again(watched):
    gyro = unit("fog_1", heard_s=20.0)
    attendance = watched.by("gyro")
    attendance.lose(gyro, 20.5, GONE)
    attendance.check([gyro], 20.0 + SILENT_S)  # told already
    attendance.back(gyro, 20.5 + SILENT_S)
    assert not gyro.gone
    assert watched.told[-1] == ("fog_1", "back: its port is open again, 10.5 s after the last it sent")
    attendance.check([gyro], 21.0 + SILENT_S)
    assert watched.invalid[1:] == ["fog_1 fell silent at 20.0 s"]


def test_a_port_that_goes_with_the_power_of_its_unit_is_no_fault_while_that_is_intended(watched):
    gyro = unit("fog_1", heard_s=20.0)
    attendance = watched.by("gyro")
    attendance.excuse_until(100.0)
    attendance.lose(gyro, 20.5, GONE)
    attendance.back(gyro, 90.0)
    assert watched.invalid == [] and len(watched.told) == 2
    attendance.lose(gyro, 95.0, GONE)
    attendance.check([gyro], 100.0 + SILENT_S)  # it was to be back by then
    assert watched.invalid == ["fog_1 fell silent at 20.0 s"]


def test_intended_silence_is_no_alarm_and_counts_from_its_end(watched):
    gyro = unit("fog_1")
    attendance = watched.by("gyro")
    attendance.excuse_until(100.0)
    attendance.check([gyro], 100.0 + SILENT_S - 0.1)
    assert (watched.told, watched.invalid) == ([], [])
    attendance.check([gyro], 100.0 + SILENT_S)
    assert watched.invalid == ["fog_1 fell silent at 0.0 s"]
    with pytest.raises(DeviceSilent):
        attendance.check([gyro], 100.0 + ALL_SILENT_S)


def test_a_unit_that_speaks_once_a_minute_is_not_silent_in_between(watched):
    platform = unit("ins", "platform", interval_s=60.0)
    attendance = watched.by("platform")
    for now_s in range(0, 600, 5):
        platform.heard_s = 60.0 * (now_s // 60)
        attendance.check([platform], float(now_s))
    assert (watched.told, watched.invalid) == ([], [])
    attendance.check([platform], platform.heard_s + 60.0 + SILENT_S)
    assert watched.invalid == ["ins fell silent at 540.0 s"]


def test_a_unit_that_stutters_is_one_reason_and_all_its_events(watched):
    gyro = unit("fog_1")
    attendance = watched.by("gyro")
    for k in range(5):
        gyro.heard_s = 20.0 * k
        attendance.check([gyro], gyro.heard_s)
        attendance.check([gyro], gyro.heard_s + SILENT_S)
    assert watched.invalid == ["fog_1 fell silent at 0.0 s"]
    assert len([text for _, text in watched.told if text.startswith("silent")]) == 5


def test_the_judge_changes_when_it_is_lost_and_does_not_change_back(watched):
    units = [unit("a"), unit("b"), unit("c")]
    attendance = watched.by("gyro")
    assert attendance.judge(units).name == "a"
    units[0].silent = True
    assert attendance.judge(units).name == "b"
    units[0].silent = False
    assert attendance.judge(units).name == "b"
    units[1].gone = units[0].gone = True
    assert attendance.judge(units).name == "c"
    units[2].silent = True  # the only one that may speak again
    assert attendance.judge(units).name == "c"
    assert [name for name, _ in watched.told] == ["b", "c"]


def test_with_no_patience_the_last_unit_ends_the_run_as_its_port_goes(watched):
    first, second = unit("fog_1", heard_s=19.995, interval_s=0.01), unit("can_1", heard_s=19.995)
    attendance = watched.by("gyro", 0.0)
    attendance.lose(first, 20.0, GONE)
    attendance.require_one([first, second], 20.0)
    attendance.lose(second, 20.0, GONE)
    attendance.excuse_until(21.0)
    attendance.require_one([first, second], 20.5)  # it is being mounted
    with pytest.raises(LinkLost, match="no gyro is left"):
        attendance.require_one([first, second], 21.0)


def test_with_no_patience_a_pause_in_a_stream_is_none_yet(watched):
    gyro = unit("fog_1", heard_s=20.0)
    attendance = watched.by("gyro", 0.0)
    attendance.check([gyro], 19.9 + SILENT_S)
    with pytest.raises(DeviceSilent, match="nothing for 10 s"):
        attendance.check([gyro], 20.0 + SILENT_S)


@pytest.mark.parametrize("gone", [0, 1])
def test_one_lost_port_beside_a_silent_unit_is_no_loss_of_all_ports(watched, gone):
    """A cable that is found out helps nobody whose other unit has no power: both are named."""
    units = [unit("fog_1", heard_s=10.0), unit("fog_2", heard_s=10.0)]
    attendance = watched.by("gyro")
    attendance.lose(units[gone], 10.0, GONE)
    with pytest.raises(DeviceSilent, match="no gyro has sent anything") as silent:
        attendance.check(units, 10.0 + ALL_SILENT_S)
    assert silent.value.where == "fog_1, fog_2"
    assert f"{units[gone].name} was lost at 10.0 s" in silent.value.found
    attendance.lose(units[1 - gone], 71.0, GONE)
    with pytest.raises(LinkLost, match="no gyro is left"):
        attendance.check(units, 72.0)
