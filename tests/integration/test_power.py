"""Supplies and loggers in runs on the emulated lab, through bytes: power cycles without a hand, case sensors."""

import json

import numpy as np
import pytest

from bench.control.discovery import identify_port
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from bench.record.events.run import Alarm, PowerDemand, Prompt, UnitsOff
from bench.record.events.safe import SafeState
from bench.record.recording import Run
from drivers.base.errors import RunAborted
from drivers.base.virtual_clock import VirtualClock
from procedures._cold_shock import ColdShockParameters, shock
from procedures._power import power_cycle

SUPPLY = """
[[supply]]
name = "psu"
driver = "{driver}"
port = "{port}"
start_s = 2
[[supply.outputs]]
number = 1
voltage_v = 5.0
current_limit_a = {limit}
units = ["fog_1"]
safe = "{safe}"
"""
LOGGER = """
[[logger]]
name = "daq"
driver = "keysight_34970a"
port = "/dev/ttyUSB7"
period_s = 2
sensors = { 101 = "fog_1 case", 102 = "room" }
"""
PORTS = {"keysight_e36300": "socket://192.168.1.30:5025", "rs_hmp": "/dev/ttyUSB6"}


class Nobody:
    """An operator who is not there."""

    def ask(self, question):
        raise RunAborted(f"somebody was asked: {question.text}")


def bench_file(tmp_path, text, driver="keysight_e36300", limit=2.0, safe="leave", logger=LOGGER):
    supply = SUPPLY.format(driver=driver, port=PORTS[driver], limit=limit, safe=safe)
    path = tmp_path / "lab.toml"
    sensor = "case_sensor = 101" if logger else "case_sensor = 1"
    text = text.replace("rate_hz = 100", "rate_hz = 10").replace("case_sensor = 1", sensor)
    path.write_text(text + supply + logger)
    return load_bench_file(path)


def procedure(function, demands=None):
    return Procedure(
        "power",
        "Power",
        "tests",
        Parameters,
        lambda bench, _: function(bench),
        lambda _: 60.0,
        lambda _: demands or Demands(),
    )


def driven(file, runs, function, demands=None, *, seed=3, operator=None):
    with EmulatedLab(file, Plant(seed=seed)) as lab:
        done = procedure(function, demands)
        asked = operator(lab) if operator else Nobody()
        result = run_procedure(RunRequest(done, done.parse({}), lab.file, runs, asked, run_id="run"))
    return result, Run.open(result.folder)


SHOCK = ColdShockParameters(soak_min=6, warm_up_min=0, hold_min=10, drift_k_per_10min=2)


@pytest.mark.parametrize("driver", PORTS)
def test_twenty_power_cycles_and_a_shock_without_a_question(bench, fog_text, tmp_path, driver):
    def campaign(run):
        for cycle in range(1, 21):
            power_cycle(run, f"cycle {cycle} of 20", 5.0)
            run.wait(10.0, "on again")
        run.chamber.start()
        shock(run, SHOCK)

    result, run = driven(bench_file(tmp_path, fog_text, driver), tmp_path / "runs", campaign, SHOCK.demands())
    assert result.outcome == "completed", result.reason
    assert bench.problems(result.folder) == []
    assert run.of(Prompt) == []
    told = [(event.output, event.on, tuple(event.units)) for _, event in run.of(PowerDemand)]
    assert told == [(1, True, ("fog_1",))] + [(1, False, ("fog_1",)), (1, True, ("fog_1",))] * 20
    assert len(run.of(UnitsOff)) == 20
    stream = run.manifest.stream["fog_1"]
    assert stream["lost"] == 0 and stream["off"] >= 20 * 4 * 10
    supply = run.readings("psu")
    time_s, current = supply["time_ns"] * 1e-9, supply["output_1_current_a"]
    for at_s, event in run.of(PowerDemand)[1:]:
        seen = current[(time_s > at_s + 1.0) & (time_s < at_s + 4.0)]
        assert len(seen) >= 2 and np.all(np.isclose(seen, 0.6 if event.on else 0.0)), (at_s, event, seen)
    safe = {state.device: state for _, state in run.of(SafeState)}
    assert safe["psu"].confirmed and safe["psu"].outputs == {"1": True}
    assert {name: entry.role for name, entry in run.manifest.devices.items()}["psu"] == "supply"


def test_the_case_sensor_of_a_logger_is_the_units(bench, fog_text, tmp_path):
    def cool(run):
        run.chamber.start()
        run.chamber.go_to(5.0, 5.0)
        run.wait(400.0)

    result, run = driven(bench_file(tmp_path, fog_text), tmp_path / "runs", cool, Demands(0, 5, 25, 5))
    assert result.outcome == "completed", result.reason
    at_s = np.arange(60.0, 390.0)
    case_c = run.case_temp_c("fog_1", at_s)
    assert case_c[0] > 22.0 > case_c[-1] + 2.0 and np.all(np.diff(case_c[120:]) < 0.05)
    logged = run.readings("daq")
    assert np.median(np.diff(logged["time_ns"])) == pytest.approx(2e9, rel=0.01)
    air = run.chamber()
    np.testing.assert_allclose(
        np.interp(at_s, logged["time_ns"] * 1e-9, logged["aux_102_temp_c"]),
        np.interp(at_s, air["time_ns"] * 1e-9, air["air_temp_c"]),
        atol=0.3,
    )


@pytest.mark.parametrize("driver", PORTS)
def test_a_supply_that_is_to_be_off_is_off_after_the_run(fog_text, tmp_path, driver):
    file = bench_file(tmp_path, fog_text, driver, safe="off", logger="")
    result, run = driven(file, tmp_path / "runs", lambda run: run.wait(5.0))
    assert result.outcome == "completed", result.reason
    safe = {state.device: state for _, state in run.of(SafeState)}
    assert safe["psu"].confirmed and safe["psu"].outputs == {"1": False}
    assert "psu safe: output 1 off" in str(safe["psu"])


def test_a_unit_that_wants_more_than_its_limit_never_speaks_and_the_supply_is_left_as_the_file_says(
    fog_text, tmp_path
):
    file = bench_file(tmp_path, fog_text, limit=0.3, safe="off", logger="")  # the unit wants 0.6 A
    result, _ = driven(file, tmp_path / "runs", lambda run: run.wait(5.0))
    assert result.outcome == "aborted"
    sent = result.folder / "raw" / "psu.sent.bin"
    assert b"OUTP OFF,(@1)" in sent.read_bytes()[sent.read_bytes().index(b"OUTP ON,(@1)") :]


def test_a_fuse_that_trips_ends_the_run(fog_text, tmp_path):
    file = bench_file(tmp_path, fog_text, "rs_hmp", logger="")

    def trips(run):
        run.wait(10.0)
        lab.perform({"act": "fault", "port": "psu", "kind": "alarm", "count": 1})
        run.wait(120.0)

    with EmulatedLab(file, Plant(seed=3)) as lab:
        done = procedure(trips)
        request = RunRequest(done, done.parse({}), lab.file, tmp_path / "runs", Nobody(), run_id="run")
        result = run_procedure(request)
    assert result.outcome == "aborted" and "the psu reports a fault" in result.reason
    alarms = [alarm.text for _, alarm in Run.open(result.folder).of(Alarm) if alarm.device == "psu"]
    assert alarms == ["output 1: its fuse has tripped"]


def test_a_sensor_that_breaks_is_an_alarm_once_and_a_gap(fog_text, tmp_path):
    file = bench_file(tmp_path, fog_text)

    def breaks(run):
        run.wait(10.0)
        lab.perform({"act": "fault", "port": "daq", "kind": "open_sensor", "count": 101})
        run.wait(20.0)

    with EmulatedLab(file, Plant(seed=3)) as lab:
        done = procedure(breaks)
        request = RunRequest(done, done.parse({}), lab.file, tmp_path / "runs", Nobody(), run_id="run")
        result = run_procedure(request)
    run = Run.open(result.folder)
    assert result.outcome == "completed", result.reason
    (alarm,) = [alarm for _, alarm in run.of(Alarm)]
    assert (alarm.device, alarm.code, alarm.facts) == ("daq", "no_reading", {"column": "aux_101_temp_c"})
    assert np.isnan(run.readings("daq")["aux_101_temp_c"]).sum() >= 8
    assert np.isfinite(run.case_temp_c("fog_1", np.arange(0.0, 30.0))).all()


def test_units_without_a_supply_are_asked_for(both_text, tmp_path):
    def cycle(run):
        run.wait(10.0)
        power_cycle(run, "cycle 1 of 1", 5.0)
        run.wait(10.0)

    file = bench_file(tmp_path, both_text, logger="")
    result, run = driven(
        file,
        tmp_path / "runs",
        cycle,
        operator=lambda lab: EmulatedOperator(lab.perform),
    )
    assert result.outcome == "completed", result.reason
    ((_, prompt),) = run.of(Prompt)
    assert prompt.question == "Switch can_1 off, wait 5 s, switch them on again (cycle 1 of 1). Done?"
    assert run.manifest.stream["can_1"]["off"] > 0 < run.manifest.stream["fog_1"]["off"]
    assert run.manifest.stream["can_1"]["lost"] == run.manifest.stream["fog_1"]["lost"] == 0


def test_the_manifest_has_the_sections_as_the_file_has_them(fog_text, tmp_path):
    file = bench_file(tmp_path, fog_text)
    plain = json.loads(json.dumps(file.model_dump(mode="json")))
    assert plain["supply"][0]["outputs"][0]["units"] == ["fog_1"] and "instruments" not in plain
    assert plain["logger"][0]["sensors"] == {"101": "fog_1 case", "102": "room"}


@pytest.mark.parametrize("driver", PORTS)
def test_ports_finds_supply_and_logger_and_sets_nothing(bench, fog_text, tmp_path, driver):
    file = bench_file(tmp_path, fog_text, driver)
    with bench.lab(file, Plant(delivery_s=0.5)) as lab:
        clock = VirtualClock(lab.file.bench.clock)
        found = {
            name: identify_port(lab.file.ports[name], clock, lambda text: None, name)
            for name in ("psu", "daq")
        }
        clock.close()
        emulators = {port.name: lab._lab._lab._emulators[at] for at, port in enumerate(lab._lab._lab.ports)}
    assert found["psu"].driver == driver, found
    assert found["daq"].driver == "keysight_34970a" and "HEWLETT-PACKARD 34970A" in found["daq"].text
    assert not any(output.on or output.voltage_v for output in emulators["psu"].outputs.values())
    assert emulators["daq"]._probes == {} and emulators["daq"]._scan == []
