"""Who speaks, who is lost, who is judged by, and when that ends a run."""

from types import SimpleNamespace

import pytest

from bench.control.stream_watchdog import SILENT_S, StreamWatchdog
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
        by=lambda tests, *last_s: StreamWatchdog(
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
    watchdog = watched.by("platform")
    watchdog.lose(platform, 900.0, GONE)
    monitor.heard_s = platform.heard_s + ALL_SILENT_S
    watchdog.check([platform, monitor], ALL_SILENT_S - 0.1)
    with pytest.raises(LinkLost, match="no platform is left") as lost:
        watchdog.check([platform, monitor], ALL_SILENT_S)
    assert "ins was lost at 900.0 s" in str(lost.value)
    platform.gone = False
    with pytest.raises(DeviceSilent, match="no platform"):
        watched.by("platform").check([platform, monitor], ALL_SILENT_S)


def test_the_last_loss_names_all_that_were_lost(watched):
    first, second = unit("fog_1"), unit("can_1")
    watchdog = watched.by("gyro")
    watchdog.lose(first, 10.0, GONE)
    assert watched.invalid == ["fog_1 was lost at 10.0 s (the port is gone: end of stream)"]
    watchdog.lose(second, 20.0, GONE)
    with pytest.raises(LinkLost) as lost:
        watchdog.check([first, second], ALL_SILENT_S)
    assert "fog_1 was lost at 10.0 s" in str(lost.value) and "can_1 was lost at 20.0 s" in str(lost.value)


def test_a_unit_that_is_back_is_told_and_its_silence_counts_again(watched):
    gyro = unit("fog_1", heard_s=20.0)
    watchdog = watched.by("gyro")
    watchdog.lose(gyro, 20.5, GONE)
    watchdog.check([gyro], 20.0 + SILENT_S)  # told already
    watchdog.back(gyro, 20.5 + SILENT_S)
    assert not gyro.gone
    assert watched.told[-1] == ("fog_1", "back: its port is open again, 10.5 s after the last it sent")
    watchdog.check([gyro], 21.0 + SILENT_S)
    assert watched.invalid[1:] == ["fog_1 fell silent at 20.0 s"]


def test_a_port_that_goes_with_the_power_of_its_unit_is_no_fault_while_that_is_intended(watched):
    gyro = unit("fog_1", heard_s=20.0)
    watchdog = watched.by("gyro")
    watchdog.excuse_until(100.0)
    watchdog.lose(gyro, 20.5, GONE)
    watchdog.back(gyro, 90.0)
    assert watched.invalid == [] and len(watched.told) == 2
    watchdog.lose(gyro, 95.0, GONE)
    watchdog.check([gyro], 100.0 + SILENT_S)  # it was to be back by then
    assert watched.invalid == ["fog_1 fell silent at 20.0 s"]


def test_intended_silence_is_no_alarm_and_counts_from_its_end(watched):
    gyro = unit("fog_1")
    watchdog = watched.by("gyro")
    watchdog.excuse_until(100.0)
    watchdog.check([gyro], 100.0 + SILENT_S - 0.1)
    assert (watched.told, watched.invalid) == ([], [])
    watchdog.check([gyro], 100.0 + SILENT_S)
    assert watched.invalid == ["fog_1 fell silent at 0.0 s"]
    with pytest.raises(DeviceSilent):
        watchdog.check([gyro], 100.0 + ALL_SILENT_S)


def test_a_unit_that_speaks_once_a_minute_is_not_silent_in_between(watched):
    platform = unit("ins", "platform", interval_s=60.0)
    watchdog = watched.by("platform")
    for now_s in range(0, 600, 5):
        platform.heard_s = 60.0 * (now_s // 60)
        watchdog.check([platform], float(now_s))
    assert (watched.told, watched.invalid) == ([], [])
    watchdog.check([platform], platform.heard_s + 60.0 + SILENT_S)
    assert watched.invalid == ["ins fell silent at 540.0 s"]


def test_a_unit_that_stutters_is_one_reason_and_all_its_events(watched):
    gyro = unit("fog_1")
    watchdog = watched.by("gyro")
    for k in range(5):
        gyro.heard_s = 20.0 * k
        watchdog.check([gyro], gyro.heard_s)
        watchdog.check([gyro], gyro.heard_s + SILENT_S)
    assert watched.invalid == ["fog_1 fell silent at 0.0 s"]
    assert len([text for _, text in watched.told if text.startswith("silent")]) == 5


def test_the_judge_changes_when_it_is_lost_and_does_not_change_back(watched):
    units = [unit("a"), unit("b"), unit("c")]
    watchdog = watched.by("gyro")
    assert watchdog.judge(units).name == "a"
    units[0].silent = True
    assert watchdog.judge(units).name == "b"
    units[0].silent = False
    assert watchdog.judge(units).name == "b"
    units[1].gone = units[0].gone = True
    assert watchdog.judge(units).name == "c"
    units[2].silent = True  # the only one that may speak again
    assert watchdog.judge(units).name == "c"
    assert [name for name, _ in watched.told] == ["b", "c"]


def test_without_a_timeout_the_last_unit_ends_the_run_as_its_port_goes(watched):
    first, second = unit("fog_1", heard_s=19.995, interval_s=0.01), unit("can_1", heard_s=19.995)
    watchdog = watched.by("gyro", 0.0)
    watchdog.lose(first, 20.0, GONE)
    watchdog.require_one([first, second], 20.0)
    watchdog.lose(second, 20.0, GONE)
    watchdog.excuse_until(21.0)
    watchdog.require_one([first, second], 20.5)  # it is being mounted
    with pytest.raises(LinkLost, match="no gyro is left"):
        watchdog.require_one([first, second], 21.0)


def test_without_a_timeout_a_pause_in_a_stream_is_none_yet(watched):
    gyro = unit("fog_1", heard_s=20.0)
    watchdog = watched.by("gyro", 0.0)
    watchdog.check([gyro], 19.9 + SILENT_S)
    with pytest.raises(DeviceSilent, match="nothing for 10 s"):
        watchdog.check([gyro], 20.0 + SILENT_S)


@pytest.mark.parametrize("gone", [0, 1])
def test_one_lost_port_beside_a_silent_unit_is_no_loss_of_all_ports(watched, gone):
    """A cable that is found out helps nobody whose other unit has no power: both are named."""
    units = [unit("fog_1", heard_s=10.0), unit("fog_2", heard_s=10.0)]
    watchdog = watched.by("gyro")
    watchdog.lose(units[gone], 10.0, GONE)
    with pytest.raises(DeviceSilent, match="no gyro has sent anything") as silent:
        watchdog.check(units, 10.0 + ALL_SILENT_S)
    assert silent.value.where == "fog_1, fog_2"
    assert f"{units[gone].name} was lost at 10.0 s" in silent.value.found
    watchdog.lose(units[1 - gone], 71.0, GONE)
    with pytest.raises(LinkLost, match="no gyro is left"):
        watchdog.check(units, 72.0)
