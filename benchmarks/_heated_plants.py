"""Thermal plants of others with a heater, a lid and loads: what the gap diagnosis names, beside their own models.

The nominal is the first and simplest model that the authors fitted (one mass); what they added to it later, and
how far that came on other days, is the measure. Their models are integrated here by Euler's method, not by our
simulator.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bench.analysis.gap import ChannelFinding, diagnose, parse_model, read_recordings
from benchmarks._fetched import fetched
from benchmarks._said import Recording, Said
from drivers.base.arrays import Array

_INCUBATOR = (
    "INTO-CPS-Association/example_digital-twin_incubator@2f08c4f6916258582715e6fc705b4c315d55baaa:"
    "software/incubator/datasets/"
)
_MARCH = (
    f"{_INCUBATOR}20210321_lid_opening_7pmodel/lid_opening_experiment_mar_2021.csv",
    "d77e0dd13660c93b00ff0597962007f9e29263980bc6c8479058ffd73a9281d5",
)
_MARCH_EVENTS = (
    f"{_INCUBATOR}20210321_lid_opening_7pmodel/events.csv",
    "5bd90a17ef631c29d3ee20687803678f0166ec64df2f11b262fcf3d1a01afd37",
)
_JANUARY = (
    f"{_INCUBATOR}20210122_lid_opening_kalman/lid_opening_experiment_jan_2021.csv",
    "b8cc1857a3830ba882175081bb6cc1c3f4f7fce6bc52680e7011ee5a277759e8",
)
_JANUARY_EVENTS = (
    f"{_INCUBATOR}20210122_lid_opening_kalman/events.csv",
    "a91c3213b6fcd69f060a102ef8ea7ace842f0d619035cf7afd97f28250a8d507",
)
_DECEMBER = (
    (
        f"{_INCUBATOR}20201221_controller_tunning/exp1_ht3_hg2.csv",
        "2c629c44b3bf3b454a4a3ca7b9a92a310e5f2ff7777db3810228a8d8fddb42bf",
    ),
    (
        f"{_INCUBATOR}20201221_controller_tunning/exp2_ht20_hg30.csv",
        "42e96a99f6ee4b3fdd56d34faf14c0256fb2ad16afe341641f48d78ed0237bb4",
    ),
)
_SEPTEMBER = (
    f"{_INCUBATOR}20200918_calibration_fan_24V/semi_random_movement.csv",
    "5ed02f670a938b9b07a3b5ec0e776fdd0fee1f74849d1eb4c52c4d34dde4982e",
)
_EMPTY = (
    f"{_INCUBATOR}20230501_calibration_empty_system/20230501_calibration_empty_system.csv",
    "f9a0a4dcc71ba2b5636ab827f43ae6d94cd3d8b64bfb52c363ae48a81dbb14dc",
)
_TEMPEH = (
    f"{_INCUBATOR}20230501_tempeh_batch/rec_2023-05-01__08_09_06.csv",
    "1e8258286c3a7e7808809f15b68d9f3d0ab798c69e058d7f601da75dc93dcc8c",
)
_TCLAB = "jckantor/CBE32338@f38981396f38bb38a02ac0961c8148d0e6137ce0:notebooks/data/"
_STEP = (f"{_TCLAB}tclab-data.csv", "fcbca9d3ce49f22f7f9edb2ef8c8d4afa7cf71fbc10c00630a624ba3dc7cd20a")
_OTHER_STEP = (
    f"{_TCLAB}step-test-data.csv",
    "902095dd114ec709b72cfa57f2e4ed470aaf20205257dfdbc0c4a958395b56b9",
)
_WATER_S, _LID_SHUT_S = 8200.0, 8300.0
"""In the March log: just before a cup of water is put in, and just after the lid was shut upon it."""
_AS_FAR = 1.1
"""Times the rms of the authors' own model that counts as having come as far."""


@dataclass(frozen=True)
class _Masses:
    """A model of the authors': one mass in air, heated by itself or through a heater's mass; W, W/K, J/K."""

    watts: float
    capacity: float
    conductance: float
    heater_capacity: float = 0.0
    heater_conductance: float = 1.0
    open_conductance: float = 0.0

    def left_k(self, log: pd.DataFrame) -> float:
        """Return the rms of what the model leaves of a log (columns t, air, case, heater, door), K."""
        time_s, air, case, heat, door = (
            log[name].to_numpy() for name in ("t", "air", "case", "heater", "door")
        )
        body = warm = float(case[0])
        left = np.zeros(len(log))
        for k, length_s in enumerate(np.diff(time_s)):
            left[k] = case[k] - body
            exchange = self.open_conductance if door[k] and self.open_conductance else self.conductance
            step_s = length_s / 20.0
            for _ in range(20):
                flow = self.watts * heat[k]
                if self.heater_capacity:
                    flow, into = self.heater_conductance * (warm - body), flow
                    warm += step_s / self.heater_capacity * (into - flow)
                body += step_s / self.capacity * (flow + exchange * (air[k] - body))
        left[-1] = case[-1] - body
        return float(np.sqrt(np.mean(left**2)))


_FIRST = _Masses(120.0, 616.56464029, 0.65001889)
_WITH_LID = _Masses(
    120.0,
    337.3098155210202,
    0.6942473395576869,
    130.00867940955158,
    2.34488115360931,
    15.010992374623484,
)
_FIRST_2023 = _Masses(11.4165310 * 1.42706637, 642.171870, 0.496056150)
_FOUR_2023 = _Masses(12.15579391 * 1.53551347, 267.55929458, 0.5763498, 329.25376821, 1.67053237)
_FIRST_TCLAB = _Masses(0.04, 12.548530552470801, 0.06278605683560866)


def _model(masses: _Masses, *, capacity: float = 0.2, conductance: float = 0.1, others: float = 0.05) -> str:
    """Return a model of the authors' as the text of a nominal; parts by which its values are uncertain."""
    given = {
        "air_to_case_conductance": ({"conductance_w_per_k": masses.conductance}, conductance),
        "case_heat_capacity": ({"case_j_per_k": masses.capacity}, capacity),
        # one mass only: what takes up no heat worth speaking of
        "fixture_heat": ({"fixture_j_per_k": 1.0, "fixture_w_per_k": 1e-4}, 0.01),
    }
    if masses.heater_capacity:
        heater = {"heater_j_per_k": masses.heater_capacity, "heater_w_per_k": masses.heater_conductance}
        given["heater_heat_capacity"] = (heater, others)
    if masses.open_conductance:
        more = {"opening_w_per_k": masses.open_conductance - masses.conductance}
        given["opening_conductance"] = (more, 0.1)
    lines = ["format = 1", "[noise]", "arw_deg_per_sqrt_h = 1.0", "[accuracy]", "case_temperature = 0.1"]
    for name, (values, part) in given.items():
        for head, factor in (("parameters", 1.0), ("sigma", part)):
            inside = ", ".join(f"{key} = {factor * value!r}" for key, value in values.items())
            lines += [f'[[effect]]\nname = "{name}"'] * (head == "parameters") + [f"{head} = {{ {inside} }}"]
    return "\n".join(lines)


def _found(
    logs: Mapping[str, pd.DataFrame], held_out: Sequence[str], nominal: str, watts: float
) -> ChannelFinding:
    """Return what the diagnosis finds in the heated body's temperature."""
    with tempfile.TemporaryDirectory() as folder:
        for name, log in logs.items():
            log.to_csv(Path(folder) / f"{name}.csv", index=False)
        mapping = Path(folder) / "map.toml"
        mapping.write_text(
            'format = 1\nunit_id = "plant"\nlatitude_deg = 50\n[columns]\ntime = { name = "t", unit = "s" }\n'
            'air = { name = "air", unit = "degC" }\nt_out = { name = "case", unit = "degC" }\n'
            f'heater = {{ name = "heater", unit = "{watts!r} W" }}\ndoor = {{ name = "door" }}\n'
            + "".join(f'[[run]]\nfile = "{name}.csv"\n' for name in logs)
        )
        given = read_recordings([mapping], [Path(name) for name in held_out])
        found = diagnose(
            given.runs, parse_model(nominal, "the authors' model"), given.held_out, given.missing
        )
    return next(channel for channel in found.channels if channel.signal == "case_temperature")


def _left(found: ChannelFinding) -> dict[str, tuple[float, float]]:
    """Return what is left of a run under the nominal model and under the closed one, rms in K."""
    return {curve.run_id: (_rms(curve.before), _rms(curve.after)) for curve in found.curves}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _named(found: ChannelFinding) -> str:
    rows = []
    for cause in found.causes:
        values = zip(cause.term.effect.parameters, cause.term.values, cause.term.sigmas, strict=True)
        text = ", ".join(f"{p.name} = {value:.3g} ± {sigma:.2g}" for p, value, sigma in values)
        others = "".join(f" or {name} ({100 * p:.0f} %)" for name, p in cause.alternatives.items())
        rows.append(f"{cause.name}{others}: {text}")
    return "; ".join(rows) or f"nothing ({found.verdict})"


def _value(found: ChannelFinding, name: str, parameter: str) -> tuple[float, float]:
    """Return the value fitted to a parameter of a cause and its uncertainty, NaN where it is not named."""
    for cause in found.causes:
        if cause.name == name:
            at = [each.name for each in cause.term.effect.parameters].index(parameter)
            return cause.term.values[at], cause.term.sigmas[at]
    return math.nan, math.nan


def _shrunk(found: ChannelFinding) -> str:
    (held,) = found.held_out
    return (
        f"{100 * held.share:.0f} % ({100 * held.low:.0f} to {100 * held.high:.0f} %) of the gap is gone"
        + (f", but {held.caution}" if held.caution else "")
    )


def _incubator(file: Path, room: str, box: Sequence[str], events: Path | None = None) -> pd.DataFrame:
    """Return a log of the incubator; times of 2021 and later are in ns."""
    table = pd.read_csv(file).dropna(subset=["time"])
    time_s = table["time"].to_numpy(np.float64)
    time_s = time_s * 1e-9 if time_s[0] > 1e12 else time_s
    door = np.zeros(len(table))
    if events is not None:
        told = pd.read_csv(events)
        for at_s, event in zip(
            told["time"].to_numpy(np.float64) * 1e-9, told["event"].astype(str), strict=True
        ):
            if event in ("Lid Opened", "Lid Closed"):
                door[time_s >= at_s] = event == "Lid Opened"
    return pd.DataFrame(
        {
            "t": time_s - time_s[0], "air": table[room], "case": table[list(box)].mean(axis=1),
            "heater": (table["heater_on"].astype(str) == "True").astype(float), "door": door,
        }
    )  # fmt: skip


def _part(log: pd.DataFrame, begin_s: float, end_s: float) -> pd.DataFrame:
    return log[(log["t"] >= begin_s) & (log["t"] < end_s)].reset_index(drop=True)


def lid_and_heater(path: Path) -> Iterator[Said]:
    cache, box = path.parent, ("t2", "t3")
    whole = _incubator(path, "t1", box, fetched(*_MARCH_EVENTS, cache))
    first, second = (_incubator(fetched(*place, cache), "t1", box) for place in _DECEMBER)
    logs = {
        "march": _part(whole, 0.0, _WATER_S),
        "december 2": second,
        "january": _incubator(fetched(*_JANUARY, cache), "t1", box, fetched(*_JANUARY_EVENTS, cache)),
        "december 1": first,
    }
    found = _found(logs, ["january", "december 1"], _model(_FIRST), _FIRST.watts)
    names = {cause.name for cause in found.causes}
    yield Said(
        "one mass is not enough: its heater has a heat capacity of its own, and the lid was opened",
        "their readme, events and model of seven parameters", _named(found),
        names == {"heater_heat_capacity", "opening_conductance"},
    )  # fmt: skip
    opened, sigma = _value(found, "opening_conductance", "opening_w_per_k")
    more = _WITH_LID.open_conductance - _WITH_LID.conductance
    yield Said(
        f"{more:.1f} W/K more with an open lid", "their fit to this log",
        f"{opened:.1f} ± {sigma:.1f} W/K", abs(opened - more) < 3.0 * sigma,
    )  # fmt: skip
    mass, sigma = _value(found, "heater_heat_capacity", "heater_j_per_k")
    yield Said(
        f"the heater has {_WITH_LID.heater_capacity:.0f} J/K", "their fit to this log",
        f"{mass:.1f} ± {sigma:.1f} J/K: its lag is seen, of its mass little",
        abs(mass - _WITH_LID.heater_capacity) < 3.0 * sigma,
    )  # fmt: skip
    masses = ("case_heat_capacity", "heater_heat_capacity")
    whole_j = sum(term.values[0] for term in found.terms if term.name in masses)
    theirs_j = _WITH_LID.capacity + _WITH_LID.heater_capacity
    yield Said(
        f"box and heater together have {theirs_j:.0f} J/K", "their fit to this log", f"{whole_j:.0f} J/K",
        abs(whole_j / theirs_j - 1.0) < 0.1,
    )  # fmt: skip
    for name in ("january", "december 1"):
        before, after = _left(found)[name]
        theirs = _WITH_LID.left_k(logs[name])
        yield Said(
            f"{name} (held out): their own model leaves {theirs:.2f} K rms", "their fit of 2021",
            f"{before:.2f} -> {after:.2f} K rms; {_shrunk(found)}", after < _AS_FAR * theirs,
        )  # fmt: skip
    september = _incubator(fetched(*_SEPTEMBER, cache), "t1", box)
    found = _found(
        {"march": logs["march"], "september": september}, ["september"], _model(_FIRST), _FIRST.watts
    )
    before, after = _left(found)["september"]
    yield Said(
        f"september, fan at 24 V, up to 59 °C: their own model leaves {_WITH_LID.left_k(september):.2f} K rms",
        "their fit of 2021", f"{before:.2f} -> {after:.2f} K rms; {_shrunk(found)}", bool(found.caution),
    )  # fmt: skip
    found = _found({"water": _part(whole, _LID_SHUT_S, 17600.0)}, [], _model(_WITH_LID), _WITH_LID.watts)
    yield Said(
        "a cup of water stands in it", "their events", _named(found),
        [cause.name for cause in found.causes] == ["fixture_heat"],
    )  # fmt: skip


def empty_and_loaded(path: Path) -> Iterator[Said]:
    whole = _incubator(path, "t3", ("t1", "t2"))
    halves = {"first half": _part(whole, 0.0, 3300.0), "second half": _part(whole, 3300.0, math.inf)}
    found = _found(halves, ["second half"], _model(_FIRST_2023), _FIRST_2023.watts)
    yield Said(
        "its heater has a heat capacity of its own", "their models of two and of four parameters",
        _named(found), [cause.name for cause in found.causes] == ["heater_heat_capacity"],
    )  # fmt: skip
    before, after = _left(found)["second half"]
    theirs = _FOUR_2023.left_k(halves["second half"])
    yield Said(
        f"second half (held out): their own models leave {_FIRST_2023.left_k(halves['second half']):.2f} K rms "
        f"(one mass) and {theirs:.2f} K rms (two)",
        "their fits to both halves", f"{before:.2f} -> {after:.2f} K rms; {_shrunk(found)}",
        after < _AS_FAR * theirs,
    )  # fmt: skip
    batch = _incubator(fetched(*_TEMPEH, path.parent), "t3", ("t1", "t2"))
    nominal = _model(_FOUR_2023, capacity=0.05, conductance=0.05)
    parts = {"first hours": _part(batch, 0.0, 14400.0), "next hours": _part(batch, 14400.0, 28800.0)}
    found = _found(parts, ["next hours"], nominal, _FOUR_2023.watts)
    yield Said(
        "325 g of beans, soaked, were put in: a mass that the models lack", "their readme", _named(found),
        [cause.name for cause in found.causes] == ["fixture_heat"],
    )  # fmt: skip
    before, after = _left(found)["next hours"]
    yield Said(
        f"four hours later (held out): their own model leaves {_FOUR_2023.left_k(parts['next hours']):.2f} K rms",
        "their fit to the empty incubator", f"{before:.2f} -> {after:.2f} K rms; {_shrunk(found)}",
        after < _FOUR_2023.left_k(parts["next hours"]) or bool(found.caution),
    )  # fmt: skip
    found = _found({"last hours": _part(batch, 60000.0, 79000.0)}, [], nominal, _FOUR_2023.watts)
    yield Said(
        "the fungus has grown: it is 37 °C warm without the heater, which was told 30 °C", "their readme",
        _named(found), "self_heating_power" in {cause.name for cause in found.causes},
    )  # fmt: skip


def _four_masses_left_k(log: pd.DataFrame) -> float:
    """Return the rms of what the model of two heaters and two thermometers of notebook 2.11 leaves, K."""
    heater_j, sensor_j, to_air, between, to_sensor = (
        6.92707544,
        1.61783224,
        0.04676309,
        0.02633501,
        0.04303801,
    )
    air = float(log["air"].iloc[0])
    heater, sensor, other, other_sensor = (np.float64(air) for _ in range(4))
    left = []
    for length_s, percent, case in zip(
        np.diff(log["t"], append=np.nan), log["heater"].to_numpy(), log["case"].to_numpy(), strict=True
    ):
        left.append(case - sensor)
        for _ in range(20):
            step_s = length_s / 20.0
            seen, seen_there, across = heater - sensor, other - other_sensor, other - heater
            flow = to_air * (air - heater) + between * across - to_sensor * seen + 0.04 * percent
            flow_there = to_air * (air - other) - between * across - to_sensor * seen_there
            heater, other = heater + step_s / heater_j * flow, other + step_s / heater_j * flow_there
            sensor += step_s / sensor_j * to_sensor * seen
            other_sensor += step_s / sensor_j * to_sensor * seen_there
    return _rms(np.array(left))


def steps_of_a_kit(path: Path) -> Iterator[Said]:
    logs = {}
    for name, file in (("one", path), ("other", fetched(*_OTHER_STEP, path.parent))):
        table = pd.read_csv(file).drop_duplicates("Time", keep="last")
        columns = {"t": table["Time"], "case": table["T1"], "heater": table["Q1"]}
        logs[name] = pd.DataFrame(columns | {"air": table["T1"].iloc[0], "door": 0.0})
    found = _found(logs, ["other"], _model(_FIRST_TCLAB, capacity=0.3), _FIRST_TCLAB.watts)
    yield Said(
        "heater and thermometer are two masses: the temperature rises late", "his notebook 2.11", _named(found),
        [cause.name for cause in found.causes] == ["heater_heat_capacity"],
    )  # fmt: skip
    before, after = _left(found)["other"]
    yield Said(
        f"another session (held out): his models leave {_FIRST_TCLAB.left_k(logs['other']):.1f} K rms (one mass) "
        f"and {_four_masses_left_k(logs['other']):.1f} K rms (four)",
        "his notebook 2.11, fitted to the first session", f"{before:.1f} -> {after:.1f} K rms; {_shrunk(found)}",
        bool(found.caution),
    )  # fmt: skip


RECORDINGS = (
    Recording("Incubator with a lid", _MARCH[0], "none stated", lid_and_heater, _MARCH[1]),
    Recording("Incubator, empty and loaded", _EMPTY[0], "none stated", empty_and_loaded, _EMPTY[1]),
    Recording("Heater of a temperature control lab", _STEP[0], "MIT", steps_of_a_kit, _STEP[1]),
)
