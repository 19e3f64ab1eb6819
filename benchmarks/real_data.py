"""Makes docs/real_data.md: `python -m benchmarks.real_data [--data DIR] [--cache DIR] [--only NAME] [--write]`.

Recordings made by others are looked at, fitted and diagnosed as a user would, and what is said is compared with
what is known to be in them. Those in `--data` (default ../shared/data) come with the project's data; the others
are fetched from where their makers published them, checked by their SHA-256 and kept in `--cache` only.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from bench.analysis.calibration import calibrate_by_hand, load_hand_record
from bench.analysis.gap import diagnose, read_model, read_recordings
from bench.analysis.look import Look, LookOptions, half_differences, look, write_files
from bench.analysis.rlg import load_chamber_cycle, study_chamber_cycle
from bench.record.exchange import import_log
from bench.record.recording import Run
from benchmarks import _foreign_fmu, _heated_plants
from benchmarks._fetched import CACHE
from benchmarks._said import Recording, Said
from drivers.base.clock import host_seconds
from drivers.base.constants import gravity_mps2
from drivers.base.errors import BenchError, ConfigurationError

PAGE = Path("docs/real_data.md")
_HEAD = """# Real recordings: what is in them, and what is said

Made by `python -m benchmarks.real_data --write` from recordings of others, kept in no part of this project.
"Right" means: agrees with what is known of the recording, or says that it cannot be known. A refusal that says
why is right where the format or the content does not carry more. Seconds are wall time, diagnosis and all, on the
machine that made this page.

"""
_MPU = LookOptions(units=["g?=0.00763359 deg/s", "a?=0.061035 mg"])
"""131 counts a deg/s and 16384 counts a g: the data sheet's smallest ranges, which its author states."""


_KINDS_OF_NOISE = ("noise_level", "bias_instability", "rate_random_walk", "quantisation")


_SUNSIDED = "sunsided/sensor-fusion@f16045a9d1d4f9037a183f436fe3c098a38ad99d:data/set-1/"


_GNSS_OF_NAVEGO = (
    "rodralez/NaveGo@550d90660dceddf70af8957f1fdc988eb763a315:examples/real-data/ekinox_gnss.mat"
)


def gap_of(found: Look, axis: str, latitude_deg: float) -> str:
    """Return what the diagnosis names beside a nominal of the noise that the look found, or "nothing"."""
    with tempfile.TemporaryDirectory() as folder:
        write_files(found, Path(folder), latitude_deg=latitude_deg)
        stem = Path(folder) / f"{found.log.stem}_{axis}"
        model = read_model(stem.with_name(f"{stem.name}_nominal.toml"))
        unit = diagnose(read_recordings([stem.with_suffix(".toml")]).runs, model).rate
        named = [
            *(cause.name for cause in unit.causes),
            *(part.name for part in unit.disturbed.terms),
            *unit.stochastic,
        ]
    return ", ".join(dict.fromkeys(named)) or "nothing"


def turned_by_nobody_knows_what(found: Look, by: str) -> Said:
    """Return whether the diagnosis names no effect of a unit that was turned by hand, but noise at most."""
    named = {axis: gap_of(found, axis, 45.0) for axis in "xyz"}
    others = {word for text in named.values() for word in text.split(", ")} - {"nothing", *_KINDS_OF_NOISE}
    said = "; ".join(f"{axis} {text}" for axis, text in named.items())
    return Said("turned by hand: turns are no errors of the gyro", by, f"diagnosis: {said}",
                not others)  # fmt: skip


def ring_laser(path: Path) -> Iterator[Said]:
    options = LookOptions(
        columns=["gyro=gf*", "accelerometer=af*"],
        units=["gf*=0.1 arcsec/sample", "af*=125 ug*s/sample"],
        rate_hz=100.0,
    )
    found = look(path, options)
    x, _, z = (3600.0 * axis.figures.mean for axis in found.axes[:3])
    latitude = np.radians(34.246048)
    west, up = -15.041067 * np.cos(latitude), 15.041067 * np.sin(latitude)
    yield Said(
        f"Earth rate {west:.2f} deg/h along x, {up:.2f} along z", "latitude and heading in its header",
        f"{x:.2f} and {z:.2f} deg/h", abs(x - west) < 0.3 > abs(z - up),
    )  # fmt: skip
    turns = len(found.motion.turns)
    yield Said("parked, never turned", "its author", f"{turns} turns", turns == 0)
    for axis in "xz":
        named = gap_of(found, axis, 34.246)
        yield Said(
            f"{axis}: people and wind move the vehicle; its gyros have a quantum of 0.1 arcsec",
            "its author, the scale in its header", f"diagnosis: {named}", "quantisation" not in named,
        )  # fmt: skip


def up_and_down(path: Path) -> Iterator[Said]:
    columns = ["time=c1", "gyro=c2,c3,c4", "accelerometer=c5,c6,c7"]
    options = LookOptions(columns=columns, units=["c[234]=deg/s"])
    pair = half_differences(look(path, options), look(path.with_name("x_adi_down.txt"), options), None)
    heavy = [axis.half_difference for axis in pair if axis.unit == "m/s^2"]
    yield Said(
        "x up, then down", "its readme", f"half differences {', '.join(f'{value:.2f}' for value in heavy)} m/s^2",
        abs(heavy[0] - 9.81) < 0.06 and max(map(abs, heavy[1:])) < 0.5,
    )  # fmt: skip


def chamber_cycle(path: Path) -> Iterator[Said]:
    study = study_chamber_cycle(*load_chamber_cycle(path))
    known = {
        "x": ("depends on the past of the temperature", "one leg"),
        "y": ("a function of temperature", "follows temperature;"),
        "z": ("does not come back", "hardly reproducible"),
    }
    for axis in study.axes:
        what, word = known[axis.axis]
        yield Said(
            f"{axis.axis}: {what}",
            "later legs of the recording, not given here",
            axis.verdict,
            word in axis.verdict,
        )
    found = look(path, LookOptions(units=["imu.gyro*=rad/s", "timestamp=ns"], still=True))
    asked = [question for question in found.questions if "not those of the recording" in question]
    yield Said("its times are 2000 times too fast", "temperature moves by 0.6 K a row",
               asked[0] if asked else "nothing asked", bool(asked))  # fmt: skip


def ferraris(path: Path) -> Iterator[Said]:
    found = look(path, LookOptions(rate_hz=102.4, units=["gyr*=deg/s"]))
    sections = json.loads(path.with_name("example_ferraris_session_list.json").read_text())
    said, right = [], True
    for axis in "xyz":
        start, stop = (sections[f"{axis}_rot"][key] / 102.4 for key in ("start", "end"))
        turns = [turn for turn in found.motion.turns if turn.start_s < stop and turn.stop_s > start]
        said += [f"{turn.axis} {turn.angle:.0f} deg" for turn in turns]
        right &= len(turns) == 1 and turns[0].axis == axis and abs(abs(turns[0].angle) - 360.0) < 15.0
    yield Said("three turns by 360 deg: x, y, z", "its section list", ", ".join(said), right)
    yield turned_by_nobody_knows_what(found, "its section list")


def positions(path: Path) -> Iterator[Said]:
    found = look(path, _MPU)
    rest_s = found.motion.rests_s[0][1]
    yield Said("at rest for 36.5 s, then turned by hand", "its header", f"first rest to {rest_s:.1f} s, "
               f"{len(found.motion.turns)} turns", abs(rest_s - 36.5) < 2.0)  # fmt: skip
    limits = {axis.channel.name: axis.figures.limits for axis in found.axes if axis.figures.limits}
    yield Said("gyros left their range of 250 deg/s", "counts of -32768 in a row",
               f"saturates: {', '.join(limits)}", "gx" in limits)  # fmt: skip
    yield turned_by_nobody_knows_what(found, "its header")


def quarter_turn(path: Path) -> Iterator[Said]:
    found = look(path, _MPU)
    turns = [f"{turn.axis} {turn.angle:.1f} deg" for turn in found.motion.turns]
    right = len(turns) == 1 and found.motion.turns[0].axis == "x"
    yield Said("one turn by 90 deg about x", "its name", ", ".join(turns),
               right and abs(abs(found.motion.turns[0].angle) - 90.0) < 3.0)  # fmt: skip
    before, after = rests_corrected_by(path.with_name("example_data_calibration.csv"), found)
    yield Said(
        "in either attitude gravity is 9.81 m/s^2", "physics",
        "calibrated by the log in many positions it is off by "
        + " and ".join(f"{size:.3f}" for size in after) + " m/s^2, before by "
        + " and ".join(f"{size:.3f}" for size in before),
        max(map(abs, after)) < 0.03,
    )  # fmt: skip


def rests_corrected_by(positions: Path, found: Look) -> tuple[list[float], list[float]]:
    """Return how far gravity is off at the rests of a log, as recorded and by a calibration on another."""
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(look(positions, _MPU), Path(folder), latitude_deg=45.0)
        mapping = next(file for file in files if file.name.endswith("_x.toml"))
        record, latitude_deg, _ = load_hand_record(mapping)
        gravity = gravity_mps2(latitude_deg, 0.0)
        compensation = calibrate_by_hand(record, gravity_mps2=gravity).compensation
    axes = {(axis.channel.kind, axis.channel.axis): axis.values for axis in found.axes}
    rate, force = (
        np.stack([axes[kind, axis] for axis in "xyz"], axis=1) for kind in ("gyro", "accelerometer")
    )
    per_s = found.clock.per_s
    _, corrected = compensation.apply("", 1.0 / per_s, rate, force, force_unit=True)
    rests = [
        slice(round((low + 0.3) * per_s), round((high - 0.3) * per_s)) for low, high in found.motion.rests_s
    ]
    before, after = (
        [float(np.linalg.norm(values[rest].mean(axis=0))) - gravity for rest in rests]
        for values in (force, corrected)
    )
    return before, after


def static(path: Path) -> Iterator[Said]:
    found = look(path, _MPU)
    yield Said("never moved", "its readme", f"{len(found.motion.rests_s)} rest, {len(found.motion.turns)} turns",
               len(found.motion.rests_s) == 1 and not found.motion.turns)  # fmt: skip
    named = gap_of(found, "y", 0.0)
    yield Said(
        "y: noise and a drift, no test was made", "its readme", f"diagnosis: {named}", named == "nothing"
    )


def can_imu(path: Path) -> Iterator[Said]:
    found = look(path, LookOptions(dbc=[path.with_name("canmod-gps.dbc")]))
    units = {axis.channel.name: axis.channel.unit for axis in found.axes}
    right = set(units.values()) == {"deg/s", "m/s²"} or set(units.values()) == {"deg/s", "m/s^2"}
    yield Said("rates in deg/s, accelerations in m/s^2, nominally 100 Hz", "its DBC file and the maker",
               f"{', '.join(sorted(set(units.values())))}, {found.clock.rate_hz:.1f} Hz",
               right and abs(found.clock.rate_hz - 100.0) < 2.0 and not found.questions)  # fmt: skip
    quanta = [axis.figures.quantum for axis in found.axes]
    yield Said("quanta 0.25 deg/s and 0.125 m/s^2", "its DBC file",
               f"{max(quanta):.4g} and {min(quanta):.4g}",
               sorted(np.round(quanta, 4)) == [0.125] * 3 + [0.25] * 3)  # fmt: skip


def phone(path: Path) -> Iterator[Said]:
    found = look(path)
    gyros = [axis.channel for axis in found.axes if axis.channel.kind == "gyro"]
    yield Said("a phone's gyro in rad/s beside the bias that Android took off", "names of its columns",
               f"{len(gyros)} gyros in {', '.join({one.unit for one in gyros})}; left alone: "
               f"{sum('bias' in name for name in found.columns.ignored)} biases",
               [one.axis for one in gyros] == [*"xyz"] and {one.unit for one in gyros} == {"rad/s"})  # fmt: skip


def bytes_of_a_serial_line(path: Path) -> Iterator[Said]:
    try:
        look(path)
        said = "columns"
    except ConfigurationError as error:
        said = error.remedy
    yield Said("binary frames of an OpenIMU", "its maker", f"refused: {said}", "--frames openimu" in said)
    found = look(path, LookOptions(frames="openimu"))
    rows, rate_hz = len(found.axes[0].values), found.clock.rate_hz
    right = rows == 2127 and abs(rate_hz - 100.0) < 1.0
    yield Said("2127 whole frames of 100 Hz", "another program's count", f"{rows} at {rate_hz:.4g} Hz", right)
    norm = math.hypot(*(axis.figures.mean for axis in found.axes if axis.channel.kind == "accelerometer"))
    yield Said("gravity", "physics", f"{norm:.3g} m/s^2 in all", abs(norm - 9.8) < 0.1)


def hand_held(path: Path) -> Iterator[Said]:
    found = look(path)
    units = {axis.channel.kind: axis.channel.unit for axis in found.axes}
    turned = {turn.axis for turn in found.motion.turns}
    yield Said("gyros in deg/s, accelerometers in g", "its header", ", ".join(units.values()),
               units == {"gyro": "deg/s", "accelerometer": "g"} and not found.questions)  # fmt: skip
    yield Said("turned about all three axes, one after the other", "the maker's example",
               f"turns about {', '.join(sorted(turned))}", turned == {*"xyz"})  # fmt: skip
    z = next(axis for axis in found.axes if axis.channel.name == "Accelerometer Z").figures.mean
    yield Said("lies level in its longest rest", "gravity", f"z {z:.2f} m/s^2", abs(z - 9.81) < 0.1)


def inertial_sensor(path: Path) -> Iterator[Said]:
    found = look(path)
    yield Said(
        "100 Hz",
        "the maker's GPS times",
        f"{found.clock.rate_hz:.4g} Hz",
        abs(found.clock.rate_hz - 100.0) < 0.5,
    )
    units = {axis.channel.kind: axis.channel.unit for axis in found.axes}
    asked = "; ".join(found.questions)
    yield Said("accelerations in g, rates in rad/s", "the maker's data sheet, not the file",
               f"{units['accelerometer']}; of gyros: {asked[:60]}...",
               units == {"accelerometer": "g", "gyro": ""} and "X Gyro" in asked)  # fmt: skip


def rover(path: Path) -> Iterator[Said]:
    found = look(path)
    yield Said(
        "200 Hz",
        "the file's own field freq",
        f"{found.clock.rate_hz:.4g} Hz",
        abs(found.clock.rate_hz - 200.0) < 1,
    )
    asked = "; ".join(found.questions)
    yield Said(
        "rates in rad/s, which the file does not say", "its readme", asked[:60] + "...", "unit" in asked
    )
    unfit = sum(axis.allan is not None and not axis.allan.fits for axis in found.axes)
    yield Said("a vehicle drives: its shaking is no noise of gyros", "its readme",
               f"no noise fit on {unfit} of {len(found.axes)} axes", unfit == len(found.axes))  # fmt: skip


def rocket(path: Path) -> Iterator[Said]:
    found = look(path)
    yield Said("waits on the pad, then flies: a pause of 18 min", "its times",
               f"{found.clock.gaps} gap of {found.clock.longest_s:.0f} s", found.clock.gaps == 1)  # fmt: skip
    units = {axis.channel.name[:3]: axis.channel.unit for axis in found.axes}
    yield Said("three gyros and accelerometers; the rest are a filter's estimates", "names of its columns",
               f"{len(found.axes)} axes", len(found.axes) == 6 and set(units) == {"raw"})  # fmt: skip
    fastest = max(found.motion.turns, key=lambda turn: abs(turn.rate))
    yield Said("tumbles in its flight, after the pause", "its state column",
               f"fastest turn {fastest.rate:.0f} deg/s from {fastest.start_s:.0f} to {fastest.stop_s:.0f} s",
               fastest.start_s > 1070.0)  # fmt: skip


def heated_plate(path: Path) -> Iterator[Said]:
    try:
        look(path)
    except ConfigurationError as error:
        yield Said(
            "two heaters, two temperatures, no gyro",
            "its header",
            f"refused: {error.what}",
            "no gyro" in error.what,
        )
    with tempfile.TemporaryDirectory() as folder:
        mapping = Path(folder) / "map.toml"
        mapping.write_text(
            'format = 1\nunit_id = "plate"\nlatitude_deg = 40\n[columns]\ntime = { name = "Time", unit = "s" }\n'
            'air = { name = "Temperature 1", unit = "degC" }\n'
            'set_point = { name = "Set Point 1", unit = "degC" }\n'
        )
        run = Run.open(import_log(path, mapping, Path(folder) / "runs"))
        air = run.chamber()["air_temp_c"]
        yield Said("599 s, from 20.8 degC on", "its columns",
                   f"a run of {run.manifest.duration_s:.0f} s from {air[0]:.1f} to {air.max():.1f} degC",
                   abs((run.manifest.duration_s or 0.0) - 598.9) < 0.1)  # fmt: skip


def turned_by_hand(path: Path) -> Iterator[Said]:
    found = look(path, LookOptions(units=["c[234]=deg/s"]))
    turns, rate_hz = found.motion.turns, found.clock.rate_hz
    yield Said(
        "100 Hz; its times are those at which a computer read it",
        "its readme",
        f"{rate_hz:.4g} Hz, {'read in bursts' if found.clock.bursts else 'even'}",
        abs(rate_hz - 100.0) < 1.0 and found.clock.bursts,
    )
    angle = sum(turn.angle for turn in turns)
    axes = {turn.axis for turn in turns}
    yield Said(
        "two turns by 360 deg about z, counter-clockwise, by hand",
        "its readme",
        f"{', '.join(sorted(axes))} by {angle:+.0f} deg in {len(turns)} turns",
        axes == {"z"} and abs(angle / 720.0 - 1.0) < 0.15,
    )


def unmoved(path: Path) -> Iterator[Said]:
    found = look(path, LookOptions(units=["c[234]=deg/s"]))
    rest_s = sum(stop - start for start, stop in found.motion.rests_s)
    yield Said(
        "never moved, 70 s",
        "its readme",
        f"{len(found.motion.turns)} turns, {rest_s:.0f} s of rest",
        not found.motion.turns and rest_s > 60.0,
    )


def counts_of_an_mti(path: Path) -> Iterator[Said]:
    found = look(path)
    yield Said(
        "three gyros in counts, a table saved as .mat",
        "its authors' program",
        f"{len(found.axes)} {found.axes[0].channel.kind}s; {found.questions[0][:40]}...",
        len(found.axes) == 3 and {axis.channel.kind for axis in found.axes} == {"gyro"},
    )
    first_s = found.motion.rests_s[0][1]
    yield Said(
        "at rest for 50 s, then turned by hand again and again",
        "its authors' program",
        f"first rest to {first_s:.0f} s, {len(found.motion.turns)} turns",
        abs(first_s - 50.0) < 5.0 and len(found.motion.turns) > 30,
    )


def autopilot(path: Path) -> Iterator[Said]:
    found = look(path)
    names = ", ".join(axis.channel.name for axis in found.axes[:3])
    yield Said(
        "inertial messages every 20 ms among others, named in the file",
        "its labels and times",
        f"{names}, {found.clock.rate_hz:.4g} Hz",
        "GyrX" in names and abs(found.clock.rate_hz - 50.0) < 0.1,
    )


def names_in_a_comment(path: Path) -> Iterator[Said]:
    found = look(path)
    unit = {axis.channel.kind: axis.channel.unit for axis in found.axes}.get("accelerometer")
    yield Said(
        "three gyros, three accelerometers in g, times in us",
        "its first line and gravity",
        f"{len(found.axes)} axes, {unit}, {found.clock.rate_hz:.4g} Hz",
        len(found.axes) == 6 and unit == "g" and abs(found.clock.rate_hz - 110.0) < 1.0,
    )


def moved_along(path: Path) -> Iterator[Said]:
    found = look(path)
    kinds = {axis.channel.kind for axis in found.axes}
    yield Said(
        "three gyros; their rates are as large as gravity by chance",
        "its name",
        ", ".join(kinds),
        kinds == {"gyro"},
    )
    largest = max((abs(turn.angle) for turn in found.motion.turns), default=0.0)
    yield Said("moved along x by hand", "its readme", f"turns by {largest:.0f} deg at most", largest < 20.0)


def three_attitudes(path: Path) -> Iterator[Said]:
    found = look(path, LookOptions(rate_hz=1200.0))
    units = {(axis.channel.kind, axis.channel.unit) for axis in found.axes}
    yield Said(
        "accelerometers in m/s^2",
        "its readme and program",
        ", ".join(" ".join(unit) for unit in units),
        units == {("accelerometer", "m/s^2")},
    )
    rests = found.motion.rests_s
    yield Said("lies still with each axis up in turn", "its readme", f"{len(rests)} rests", len(rests) == 3)


def flight_computer(path: Path) -> Iterator[Said]:
    found = look(path)
    kinds = {axis.channel.name: axis.channel.kind for axis in found.axes}
    right = kinds == {f"c{n}": "accelerometer" if n < 5 else "gyro" for n in range(2, 8)}
    yield Said(
        "no header; time, three accelerometers in m/s^2, three gyros, six more",
        "a file beside it",
        ", ".join(f"{name} {kind}" for name, kind in kinds.items()),
        right and found.clock.known,
    )
    first = found.motion.turns[0].start_s if found.motion.turns else math.nan
    yield Said(
        "rests for about 50 s, then moved about 30 times",
        "a file beside it",
        f"first turn at {first:.0f} s, {len(found.motion.turns)} turns",
        abs(first - 50.0) < 5.0 and 20 <= len(found.motion.turns) <= 40,
    )


def rests_between_turns(path: Path) -> Iterator[Said]:
    found = look(path, LookOptions(rate_hz=100.0))
    kinds = [axis.channel.kind for axis in found.axes]
    yield Said(
        "no header; accelerometers, then gyros",
        "its authors' program",
        ", ".join(dict.fromkeys(kinds)),
        {axis.channel.name: axis.channel.kind for axis in found.axes}
        == {f"c{n}": "accelerometer" if n < 4 else "gyro" for n in range(1, 7)},
    )
    rests = len(found.motion.rests_s)
    yield Said(
        "stands still after each of its turns",
        "its authors",
        f"{rests} rests, {len(found.motion.turns)} turns",
        rests >= 10 and len(found.motion.turns) >= 10,
    )


def no_inertial_sensor(path: Path) -> Iterator[Said]:
    try:
        look(path)
    except ConfigurationError as error:
        yield Said(
            "positions and velocities, no gyro",
            "names of its columns",
            f"refused: {error.what}",
            "no gyro" in error.what,
        )
    else:
        yield Said("positions and velocities, no gyro", "names of its columns", "gyros", False)


RECORDINGS = (
    Recording(
        "Ring-laser IMU in a parked vehicle", "rlg_psins_vehicle_static/lasergyro.imu", "BSD-2", ring_laser
    ),
    Recording("MEMS up and down", "mems_adi_updown/x_adi_up.txt", "MIT", up_and_down),
    Recording(
        "MEMS through a chamber cycle", "mems_chamber_cycle/imu_raw_data_first_legs.csv", "MIT", chamber_cycle
    ),
    Recording("Ferraris session", "ferraris_imucal/example_ferraris_session.csv", "MIT", ferraris),
    Recording(
        "MPU-6050 in many positions", "multiposition_mpu6050/example_data_calibration.csv", "MIT", positions
    ),
    Recording("MPU-6050 turned once", "multiposition_mpu6050/imu_90_x_rot.csv", "MIT", quarter_turn),
    Recording("MPU-6050 at rest", "multiposition_mpu6050/example_data_tinit_calc.csv", "MIT", static),
    Recording("IMU on a vehicle's CAN", "can_canmod_gps/00000005-60FEB5A8.MF4", "MIT", can_imu),
    Recording("Phone in a car", "can_rav4_comma2k19/phone_gyro.csv", "MIT", phone),
    Recording("Serial line of an OpenIMU", "serial_openimu/z1.raw", "Apache-2.0", bytes_of_a_serial_line),
    Recording(
        "Hand-held IMU",
        "xioTechnologies/Fusion@d69784c8f7058a6545802b8852d26d6fcfd5e119:Examples/Python/sensor_data.csv",
        "MIT",
        hand_held,
        "a2833a207b4c0c51d52ee62e42069d1a11cf94b1aca1cd46a54d5e8fce577dcd",
    ),
    Recording(
        "3DM-GX3-35",
        "rodralez/NaveGo@550d90660dceddf70af8957f1fdc988eb763a315:examples/sensor-read-example/miscrostrain.csv",
        "LGPL-3.0",
        inertial_sensor,
        "adca8ca799df507407c232be8fb827e75cfbd9373c5ddc384c6f1648c811578a",
    ),
    Recording(
        "Rover on a planet's stand-in",
        "rodralez/NaveGo@550d90660dceddf70af8957f1fdc988eb763a315:"
        "examples/visual-data/canada-planetary-data/data/imu_planetary.mat",
        "LGPL-3.0",
        rover,
        "1c51ff3653367e3ca9fd593e9a4d3f245dc666526207c9759891c5edd2eacd1c",
    ),
    Recording(
        "Rocket flight",
        "NCSU-High-Powered-Rocketry-Club/AirbrakesV2@73fa7963a095b13be4f61965446dd36eb2a1655f:"
        "launch_data/real_firm_launches/jackpot_launch_1.csv",
        "MIT",
        rocket,
        "cf949df3219405067594816f3b3480f96c6f7b14c9d9381a8556f02fd1a2e297",
    ),
    Recording(
        "Heated plate",
        "APMonitor/arduino@f36e65a70dd7122d1829883899e40e56bf6c4279:"
        "2_Regression/Energy_balance_MIMO/Python_minimize/data.txt",
        "Apache-2.0",
        heated_plate,
        "10278caee2b095cca028e19acd9146157a75cdd8426e0490231de7a9def8ebdc",
    ),
    *_heated_plants.RECORDINGS,
    *_foreign_fmu.RECORDINGS,
    Recording(
        "MPU-6050 turned by hand",
        f"{_SUNSIDED}rotate-360ccw-around-z-pointing-up/mpu6050_gyroscope.mat",
        "EUPL-1.2",
        turned_by_hand,
        "beca713e77056aeb2a9526338d1d6a11abaf14c5c2037e1ffe3d29b7ec1ee66b",
    ),
    Recording(
        "MPU-6050 on a table",
        f"{_SUNSIDED}unmoved-x-pointing-up/mpu6050_gyroscope.mat",
        "EUPL-1.2",
        unmoved,
        "a2e248a32a49cb835f69f6b759c5bc5994a8f5abfc18ff1ae1deb8f03ed73f92",
    ),
    Recording(
        "MTi in many positions",
        "Kyle-ak/imu_tk@7780270fb9a227c79323199303f23989e689a89d:bin/test_data/xsens_gyro.mat",
        "BSD",
        counts_of_an_mti,
        "e0d6cc7ccbc996aba3dae5063e97360a8b765ad1dffd02eae8ec69820eb37c1d",
    ),
    Recording(
        "Autopilot of an aeroplane",
        "priseborough/InertialNav@037c5c3acb66e84d7a9d5fe03262455312e11d55:TestData/TestLog2.mat",
        "BSD-3",
        autopilot,
        "874f886d25e5cc8167408dfa47d1473b47b8372645db8ca0abf31529b4ae7bd5",
    ),
    Recording(
        "Tracker with names in a comment",
        "thomas-haslwanter/scikit-kinematics@14bed21f56327cabb031cde072735e1cf995d657:tests/data/data_yei.txt",
        "BSD-2",
        names_in_a_comment,
        "e59507292ee7d46af28be6c754bbb005c4eaa456888f382d7fc21da19a80921f",
    ),
    Recording(
        "MPU-6050 moved by hand",
        f"{_SUNSIDED}pan-x-pointing-forward/mpu6050_gyroscope.mat",
        "EUPL-1.2",
        moved_along,
        "eba19d7015b672608492116289e856f2781e7e2323d027d10814f93406f377e1",
    ),
    Recording(
        "Accelerometers on three sides",
        "Maskul93/MIMU-calib-tutorial@2926f70d8dda0fd4ee647b9aca09294f5b994017:data/acc_triax.mat",
        "none stated",
        three_attitudes,
        "e5985fc331f56cc5ef8c9dc300e37912fa5590f4dfc6141c0b28b16f5a7bdcc2",
    ),
    Recording(
        "Flight computer turned by hand",
        "SunDevilRocketry/IMU-Calibration@dc1ed4d6b219e50b936385c617674022b7c3e01b:"
        "Rev2_IMU_Data/IMU_Rev2_Data_Long.txt",
        "none stated",
        flight_computer,
        "43d5e70a50a0ce90d954d79bb90438cdc014884dc55a0dda9b5fc9ce3747709e",
    ),
    Recording(
        "MPU-9150 turned and left alone",
        "mikoff/imu-calib@12dff577725dbc7bd7161431e4142b6249395fec:data/imu0.log",
        "MIT",
        rests_between_turns,
        "b99da3fe9018966b1cd37cb26426f9c0b57be6fe84f33614b649f40246f3de01",
    ),
    Recording(
        "Position of a phone",
        "timdrysdale/imu-data@8fbb3dbb00d34d876939328868764282f3a5c3a4:00/Location.csv",
        "AGPL-3.0",
        no_inertial_sensor,
        "543c6973147d85b96602da5008d377efd0471e35e149a406530232a7518853da",
    ),
    Recording(
        "GNSS receiver",
        _GNSS_OF_NAVEGO,
        "LGPL-3.0",
        no_inertial_sensor,
        "13f8a2611ad6df24cb875593dac00702b31cb9125e69eb6ebd9b2c276a9bcd9c",
    ),
)


def page(data: Path, cache: Path, only: Collection[str] = (), old: str = "") -> str:
    """Return the page; recordings that cannot be had are named in it.

    Of those not among `only`, if that has names, the sections of the `old` page are taken as they stand.
    """
    sections, missing = [], []
    kept = {part.partition("\n")[0]: f"## {part.rstrip()}\n" for part in old.split("\n## ")[1:]}
    for recording in RECORDINGS:
        try:
            if only and recording.name not in only:
                sections.append(kept[recording.name])
            else:
                sections.append(_section(recording, data, cache))
        except KeyError:
            missing.append(f"{recording.name}: not in the page as it stands, and not asked for")
        except OSError as error:
            missing.append(f"{recording.name}: {error}")
    rows = [line for section in sections for line in section.splitlines() if line.startswith("| ")]
    right = sum(line.endswith("| yes |") for line in rows)
    total = right + sum(line.endswith("| **no** |") for line in rows)
    summary = f"{right} of {total} statements right, {len(RECORDINGS) - len(missing)} recordings.\n"
    if missing:
        summary += "\nNot had: " + "; ".join(missing) + ".\n"
    return _HEAD + summary + "\n" + "\n".join(sections)


def _section(recording: Recording, data: Path, cache: Path) -> str:
    began_s = host_seconds()
    path = recording.path(data, cache)
    try:
        rows = list(recording.check(path))
    except BenchError as error:
        rows = [Said("can be read", "its maker", f"refused: {error}", False)]
    took_s = host_seconds() - began_s
    print(f"{recording.name}: {sum(row.right for row in rows)} of {len(rows)} right, {took_s:.1f} s")
    place = recording.place.replace("@", " @ ").replace(":", " : ") if recording.sha256 else recording.place
    lines = [
        f"## {recording.name}", "", f"`{place}`, {recording.licence}, {took_s:.1f} s", "",
        "| known | by | said | right |", "|---|---|---|---|",
        *(
            f"| {row.known} | {row.by} | {row.said.replace('|', '/')} | {'yes' if row.right else '**no**'} |"
            for row in rows
        ),
        "",
    ]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="recordings of the project")
    parser.add_argument("--cache", type=Path, default=CACHE, help="where fetched recordings are kept")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="those only; others stay as they are"
    )
    parser.add_argument("--write", action="store_true", help=f"write {PAGE}")
    arguments = parser.parse_args()
    if unknown := sorted(set(arguments.only) - {recording.name for recording in RECORDINGS}):
        parser.error(f"no such recording: {', '.join(unknown)}")
    old = PAGE.read_text(encoding="utf-8") if arguments.only else ""
    text = page(arguments.data, arguments.cache, arguments.only, old)
    if arguments.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
