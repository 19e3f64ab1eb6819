"""The platform's line: checksums from outside, any chunking, driver against emulator, days in virtual
time."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import xor
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.analysis.heading._lagged import fit_lagged
from bench.analysis.heading._log import Site, log_from_positions
from bench.analysis.heading._modulus import modulus_test
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S, UG_MPS2, gravity_mps2
from drivers.base.errors import DeviceRefused, DeviceSilent, WrongDevice
from drivers.platform._driver import PinsConfig, PlatformIns
from drivers.platform.codec import FORCE, PlatformDecoder, checksum, encode_position, parse, sentence
from simulators.config import Accelerometers
from simulators.emulators.platform import PlatformEmulator
from simulators.plant.accelerometers import AccelerometerErrors, draw_accelerometers
from simulators.plant.lab_platform import LabPlatform, PlatformSignal
from simulators.plant.space_stable import PlatformSamples, SpaceStablePlatform, draw_platform
from tests.memory_link import Fake, MemoryLink, OpenConnection

KEYS: dict[str, Any] = {"name": "ins", "driver": "platform_ins", "unit": "P-7", "port": "memory"}
# The examples that NMEA 0183's descriptions are known by.
NMEA = (
    b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47",
    b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A",
)


class Plant:
    """A position that is a known function of time."""

    def __init__(self) -> None:
        self.aligned_s: list[float] = []

    def measure(self, times_s: np.ndarray) -> PlatformSignal:
        temp = np.where(times_s > 1000.0, np.nan, 45.0 + 1e-4 * times_s)
        force = np.stack([1e-3 * times_s, -9.8 + 0.0 * times_s, np.full(len(times_s), np.nan)], axis=1)
        return PlatformSignal(
            40.0 + 1e-6 * times_s, 179.9999 + 1e-6 * times_s, temp, 23.0 + 0.0 * times_s, force
        )

    def align(self, now_s: float) -> None:
        self.aligned_s.append(now_s)


@pytest.mark.parametrize("line", NMEA)
def test_checksum_is_that_of_nmea(line: bytes) -> None:
    assert b"%02X" % checksum(line[1:-3]) == line[-2:]
    fields = parse(line)
    assert fields is not None and fields[0] == line[1:6].decode()
    assert parse(line.replace(b"W*", b"E*").replace(b"M,,", b"N,,")) is None


def test_a_sentence_byte_for_byte() -> None:
    text = encode_position(65537, 40.0, 180.25, float("nan"), 23.5, 7)
    body = b"PINS,1,+40.00000000,-179.75000000,,23.5000,07"
    assert text == b"$" + body + b"*%02X\r\n" % reduce(xor, body)
    assert sentence("PINSQ", "ID") == b"$PINSQ,ID*%02X\r\n" % reduce(xor, b"PINSQ,ID")
    body += b",+0.0000001,,-9.8066500"
    forced = encode_position(65537, 40.0, 180.25, float("nan"), 23.5, 7, (1e-7, float("nan"), -9.80665))
    assert forced == b"$" + body + b"*%02X\r\n" % reduce(xor, body)


def test_a_record_with_and_without_accelerometers_is_read_either_way() -> None:
    plain = encode_position(1, 40.0, 10.0, 45.0, 20.0, 3)
    forced = encode_position(2, 40.0, 10.0, 45.0, 20.0, 3, (1.25, -9.5, float("nan")))
    longer = sentence(*(parse(forced.rstrip()) or []), "0.0")
    decoder = PlatformDecoder(60.0, accelerometers=True)
    columns = decoder.feed(plain + longer + forced).columns
    np.testing.assert_array_equal(
        np.stack([columns[name] for name in FORCE]), [[np.nan, 1.25], [np.nan, -9.5], [np.nan, np.nan]]
    )
    assert decoder.counts.rejected == {"fields": 1}
    without = PlatformDecoder(60.0).feed(plain + forced).columns
    assert not set(FORCE) & set(without)
    assert without["counter"].tolist() == columns["counter"].tolist() == [1, 2]


rows = st.lists(
    st.tuples(
        st.floats(-90, 90),
        st.floats(-180, 179.99),
        st.one_of(st.just(float("nan")), st.floats(-50, 99)),
        st.integers(0, 255),
    ),
    max_size=6,
)


@given(rows, st.lists(st.integers(1, 60), max_size=20), st.binary(max_size=20))
@settings(max_examples=60, deadline=None)
def test_any_chunking_gives_the_same_rows(
    values: list[tuple[float, float, float, int]], cuts: list[int], noise: bytes
) -> None:
    noise = noise.replace(b"$", b"").replace(b"\n", b"")
    lines = [
        encode_position(at, latitude, longitude, temp, 20.0, status)
        for at, (latitude, longitude, temp, status) in enumerate(values)
    ]
    stream = noise + b"".join(lines)
    whole = PlatformDecoder(60.0)
    batch = whole.feed(stream)
    assert (
        batch.end_offset.tolist()
        == (len(noise) + np.cumsum([len(line) for line in lines])).astype(int).tolist()
    )
    np.testing.assert_allclose(batch.columns["latitude_deg"], [row[0] for row in values], atol=6e-9)
    np.testing.assert_allclose(batch.columns["temp_c"], [row[2] for row in values], atol=6e-5)
    assert batch.columns["valid"].tolist() == [row[3] & 3 == 3 for row in values]
    pieces, at = PlatformDecoder(60.0), 0
    found: list[float] = []
    for size in [*cuts, len(stream)]:
        found += pieces.feed(stream[at : at + size]).columns["longitude_deg"].tolist()
        at += size
    assert found == batch.columns["longitude_deg"].tolist()
    assert pieces.counts.frames == whole.counts.frames == len(values)
    assert pieces.counts.rejected == whole.counts.rejected


def test_damage_is_counted_by_reason() -> None:
    good = encode_position(1, 40.0, 10.0, 45.0, 20.0, 3)
    decoder = PlatformDecoder(60.0)
    assert len(decoder.feed(good.replace(b"45.", b"46."))) == 0
    assert len(decoder.feed(sentence("PINS", "1", "95.0", "10", "", "", "03") + good[:20] + good)) == 1
    assert len(decoder.feed(sentence("PINSA", "NAVIGATE") + b"x" * 200)) == 0
    assert decoder.counts.rejected == {"checksum": 1, "fields": 1, "length": 1}
    assert (
        decoder.counts.bytes_skipped
        == len(good) + len(sentence("PINS", "1", "95.0", "10", "", "", "03")) + 20 + 200
    )


def test_driver_and_emulator() -> None:
    plant = Plant()
    link = MemoryLink(PlatformEmulator(plant, serial_number="P-7"))
    ins = PlatformIns(PinsConfig(**KEYS, period_s=30), OpenConnection(link))
    identity = ins.identify()
    assert (identity.serial_number, identity.firmware) == ("P-7", "1.0")
    ins.start()
    begin = len(link.raw)
    link.advance(link.now() + 301.0)
    ins.navigate()
    link.advance(link.now() + 1200.0)
    decoder = PlatformDecoder(ins.period_s)
    columns = decoder.feed(link.raw[begin:]).columns
    assert (decoder.counter_modulo, decoder.counter_step, decoder.nominal_rate_hz) == (65536, 1.0, 1 / 30)
    time_s = 30.0 * (1 + np.arange(len(columns["counter"])))
    assert len(time_s) == 50
    np.testing.assert_allclose(columns["latitude_deg"], 40.0 + 1e-6 * time_s, atol=6e-9)
    np.testing.assert_allclose(
        columns["longitude_deg"], (179.9999 + 1e-6 * time_s + 180.0) % 360.0 - 180.0, atol=6e-9
    )
    assert np.isnan(columns["temp_c"][time_s > 1000.0]).all()
    assert columns["valid"].tolist() == [False] * 10 + [True] * 40
    assert plant.aligned_s == [pytest.approx(301.05, abs=0.2)]
    ins.stop()
    quiet = len(link.raw)
    link.advance(link.now() + 100.0)
    assert len(link.raw) == quiet


def test_accelerometers_are_sent_when_the_bench_file_has_them() -> None:
    link = MemoryLink(PlatformEmulator(Plant()))
    ins = PlatformIns(PinsConfig(**KEYS, accelerometers=True), OpenConnection(link))
    ins.start()
    link.advance(link.now() + 301.0)
    columns = PlatformDecoder(60.0, accelerometers=True).feed(link.raw).columns
    np.testing.assert_allclose(columns[FORCE[0]], 1e-3 * 60.0 * np.arange(1, 6), atol=6e-8)
    np.testing.assert_array_equal(columns[FORCE[1]], np.full(5, -9.8))
    assert np.isnan(columns[FORCE[2]]).all()
    ins.stop()
    begin = len(link.raw)
    link.write(sentence("PINSQ", "FORCE", "0") + sentence("PINSQ", "START"))
    link.advance(link.now() + 121.0)
    later = [line for line in link.raw[begin:].splitlines() if line.startswith(b"$PINS,")]
    assert [len(parse(line) or ()) for line in later] == [7, 7]
    emulator = PlatformEmulator(Plant())
    for asked in ((), ("2",), ("1", "1")):
        answer = emulator.receive(sentence("PINSQ", "FORCE", *asked), 0.0)[0].data
        assert answer == sentence("PINSE", "FORCE is 0 or 1")

    def older(sent: bytes) -> bytes:
        return sentence("PINSE", "unknown command") if b"FORCE" in sent else sentence("PINSA", "PERIOD")

    ins = PlatformIns(PinsConfig(**KEYS, accelerometers=True), OpenConnection(MemoryLink(Fake(older))))
    with pytest.raises(DeviceRefused, match="take `accelerometers` out of the bench file"):
        ins.start()


def _forces(errors: AccelerometerErrors, headings: Array) -> PlatformSamples:
    """What a platform of great drift does, without noise of its own, navigating from the first sample on."""
    quiet = replace(draw_platform(2, effect_dph=0.02).quiet(), accelerometers=errors)
    platform = SpaceStablePlatform(quiet, 5, 300.0, angle_rad=0.4)
    platform.align()
    return platform.advance(headings)


def test_specific_force_is_gravity_in_the_platform_s_axes() -> None:
    headings = np.repeat([0.0, 90.0], 288)
    moved = _forces(AccelerometerErrors(), headings)
    angle = 0.4 + EARTH_RATE_RAD_S * moved.time_s
    pole, day = np.radians(50.0), np.zeros_like(angle)
    up = np.stack([np.sin(pole) * np.cos(angle), np.sin(pole) * np.sin(angle), day + np.cos(pole)], axis=1)
    turned = Rotation.from_rotvec(np.radians(moved.phi_as / 3600.0)).apply(up)
    largest = float(np.abs(moved.phi_as).max())
    assert 500.0 < largest < 5000.0
    np.testing.assert_allclose(np.linalg.norm(moved.force_mps2, axis=1), gravity_mps2(40.0), rtol=1e-12)
    # the small-angle turn differs from the exact one by half its square
    np.testing.assert_allclose(
        moved.force_mps2, gravity_mps2(40.0) * turned, atol=10.0 * np.radians(largest / 3600.0) ** 2
    )


def test_each_error_of_the_accelerometers_is_its_own() -> None:
    headings = np.repeat([0.0, 90.0, 180.0], 288)
    exact = _forces(AccelerometerErrors(), headings)
    one, two = np.array([1.0, -2.0, 3.0]), np.array([[4.0, 0.0, -1.0], [2.0, 5.0, 0.0]])
    warmer = exact.temp_c - 45.0
    assert np.ptp(warmer) > 0.3
    for errors, expected in (
        (AccelerometerErrors(bias_mps2=one), np.tile(one, (864, 1))),
        (AccelerometerErrors(scale=one), exact.force_mps2 * one),
        (AccelerometerErrors(per_k_mps2=one), warmer[:, None] * one),
        (
            AccelerometerErrors(heading_mps2=two),
            np.repeat([0.0 * one, two[1] - two[0], -2.0 * two[0]], 288, axis=0),
        ),
    ):
        found = _forces(errors, headings).force_mps2 - exact.force_mps2
        np.testing.assert_allclose(found, expected, atol=1e-9)
    noisy = AccelerometerErrors(white_mps2_per_sqrt_hz=2.0)
    white = _forces(noisy, headings).force_mps2 - exact.force_mps2
    # a one-sided density N^2 averaged over T has the variance N^2 / 2 T
    assert float(np.std(white)) == pytest.approx(2.0 / np.sqrt(600.0), rel=0.05)
    slow = _forces(AccelerometerErrors(wander_mps2=2.0, wander_h=1.0), np.zeros(20_000)).force_mps2
    slow = slow - _forces(AccelerometerErrors(), np.zeros(20_000)).force_mps2
    assert float(np.std(slow)) == pytest.approx(2.0, rel=0.1)
    assert np.mean(slow[12:] * slow[:-12]) == pytest.approx(4.0 * np.exp(-1.0), rel=0.2)


def test_sound_accelerometers_do_not_go_with_heading() -> None:
    """Bytes of five sound units over three headings of 30 h, decoded: no modulus is called changed."""

    def table(time_s: float) -> float:
        return 120.0 * (time_s // (30.0 * 3600.0))

    changed, sizes = [], []
    for seed in range(5):
        parameters = replace(draw_platform(seed), accelerometers=draw_accelerometers(seed, Accelerometers()))
        emulator = PlatformEmulator(LabPlatform(parameters, seed, table, step_s=300.0, navigation="linear"))
        for asked in (("FORCE", "1"), ("START",)):
            emulator.receive(sentence("PINSQ", *asked), 0.0)
        block = emulator.stream(90.0 * 3600.0)
        assert block is not None
        columns = PlatformDecoder(60.0, accelerometers=True).feed(block.data).columns
        time_s = 60.0 * (1 + np.arange(len(columns["counter"])))
        log = log_from_positions(
            time_s,
            *(columns[name] for name in ("latitude_deg", "longitude_deg", "temp_c")),
            np.array([table(time) for time in time_s]),
            Site(40.0, 0.0),
        )
        test = modulus_test(replace(log, force_mps2=np.stack([columns[name] for name in FORCE], axis=1)))
        assert test is not None and len(test.headings_deg) == 2
        changed.append(test.changed)
        sizes.append(test.sigma_ug.max())
    assert changed == [False] * 5
    assert max(sizes) < 6.0  # no test is blind: a wander of 2 ug and little white noise


def test_a_unit_s_accelerometers_have_the_sizes_of_the_plant_file() -> None:
    sizes = Accelerometers(bias_ug=100.0, scale_ppm=20.0, per_k_ug=3.0, heading_ug=7.0)
    drawn = [draw_accelerometers(seed, sizes) for seed in range(400)]
    for name, size in (
        ("bias_mps2", 100.0 * UG_MPS2),
        ("scale", 20e-6),
        ("per_k_mps2", 3.0 * UG_MPS2),
        ("heading_mps2", 7.0 * UG_MPS2),
    ):
        values = np.array([getattr(each, name) for each in drawn])
        assert float(values.std()) == pytest.approx(size, rel=0.08)
        np.testing.assert_array_equal(values[3], getattr(draw_accelerometers(3, sizes), name))


def test_devices_that_are_not_one() -> None:
    with pytest.raises(DeviceSilent, match="nothing on the line"):
        PlatformIns(PinsConfig(**KEYS), OpenConnection(MemoryLink(Fake(lambda _: b"")))).identify()
    with pytest.raises(WrongDevice, match=r"begin with \$PINS"):
        PlatformIns(PinsConfig(**KEYS), OpenConnection(MemoryLink(Fake(lambda _: b"HELLO\r\n")))).identify()
    with pytest.raises(DeviceRefused, match="no gyro here"):
        PlatformIns(
            PinsConfig(**KEYS),
            OpenConnection(MemoryLink(Fake(lambda _: sentence("PINSE", "no gyro here")))),
        ).identify()


def test_arrival_marks_follow_the_baud_rate() -> None:
    emulator = PlatformEmulator(Plant(), period_s=60, baudrate=9600)
    emulator.receive(sentence("PINSQ", "START"), 0.0)
    assert emulator.stream(59.0) is None
    block = emulator.stream(200.0)
    assert block is not None
    sizes = [len(line) + 1 for line in block.data.split(b"\n")[:-1]]
    assert block.marks[:, 0].tolist() == np.cumsum(sizes).tolist()
    np.testing.assert_allclose(block.marks[:, 1] * 1e-9, 60.0 * np.arange(1, 4) + np.array(sizes) * 10 / 9600)


def test_days_on_the_line_can_be_fitted() -> None:
    """Bytes of an emulated platform, four headings in 192 h after 240 h of alignment, decoded and fitted."""
    parameters = draw_platform(3, in_class=True)
    headings = (0.0, 90.0, 180.0, 270.0)

    def table(time_s: float) -> float:
        return headings[int(np.clip((time_s / 3600.0 - 240.0) // 48.0, 0, 3))]

    emulator = PlatformEmulator(
        LabPlatform(parameters, 5, table, longitude_deg=100.0, step_s=300.0, navigation="linear"), period_s=60
    )
    emulator.receive(sentence("PINSQ", "START"), 0.0)
    decoder, columns = PlatformDecoder(60.0), []
    for hour in range(240 + 192):
        if hour == 240:
            emulator.receive(sentence("PINSQ", "NAVIGATE"), 3600.0 * hour)
        block = emulator.stream(3600.0 * (hour + 1))
        assert block is not None
        columns.append(decoder.feed(block.data).columns)
    joined = {name: np.concatenate([each[name] for each in columns]) for name in columns[0]}
    time_s = 60.0 * (1 + np.arange(len(joined["counter"])))
    use = joined["valid"]
    assert np.count_nonzero(use) == 192 * 60
    log = log_from_positions(
        time_s[use],
        joined["latitude_deg"][use],
        joined["longitude_deg"][use],
        joined["temp_c"][use],
        np.array([table(time) for time in time_s[use]]),
        Site(40.0, 100.0),
    )
    model = fit_lagged(log)
    assert model.evidence.cause == "temperature"
    assert model.tau_s / 3600.0 == pytest.approx(parameters.core_tau_h, rel=0.15)


def test_lab_platform_is_the_plant_however_it_is_asked() -> None:
    parameters = draw_platform(1)
    plant = SpaceStablePlatform(parameters, 9, 60.0)
    plant.advance(np.zeros(61))
    plant.align()
    direct = plant.advance(np.full(240, 30.0))
    lab = LabPlatform(parameters, 9, lambda time_s: 0.0 if time_s <= 3600.0 else 30.0, navigation="linear")
    lab.measure(np.array([600.0]))
    lab.align(3600.0)
    parts = [lab.measure(60.0 * np.arange(start, start + 40)) for start in range(61, 301, 40)]
    north = 3600.0 * (np.concatenate([part.latitude_deg for part in parts]) - 40.0)
    np.testing.assert_allclose(north, direct.north_as, atol=1e-8)
    np.testing.assert_allclose(np.concatenate([part.temp_c for part in parts]), direct.temp_c, atol=1e-12)
