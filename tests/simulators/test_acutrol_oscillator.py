"""Synthesis and Track of the emulated ACUTROL3000, by the manual's own lines and a sine by hand (TM-8004-C)."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from simulators.emulators.acutrol import AcutrolAxis, AcutrolEmulator
from simulators.plant.table import TableAxis, TableParameters

PLAIN = TableParameters(
    ripple_once_ppm=0.0,
    ripple_twice_ppm=0.0,
    encoder_error_arcsec=0.0,
    encoder_noise_arcsec=0.0,
    encoder_ripple_arcsec=0.0,
    max_acceleration_dps2=4200.0,
)
W = 2.0 * math.pi * PLAIN.servo_bandwidth_hz
AT_AMPLITUDE, AT_FREQUENCY = 1 << 10, 1 << 11


class Controller:
    """A controller with one axis, asked line by line at a lab time."""

    def __init__(self, low: float | None = None, high: float | None = None) -> None:
        self.plant = TableAxis(PLAIN)
        self._device = AcutrolEmulator({1: AcutrolAxis(self.plant, low, high)})
        assert self.tell(":int:close 1") == "OK"

    def ask(self, line: str, now_s: float = 0.0) -> tuple[int, str]:
        (reply,) = self._device.receive(line.encode() + b"\r\n", now_s)
        code, length = struct.unpack("<II", reply.data[:8])
        assert length == len(reply.data) - 8
        return code, reply.data[8:].decode()

    def tell(self, line: str, now_s: float = 0.0) -> str:
        code, text = self.ask(line, now_s)
        assert code == 0, text
        return text

    def bits(self, now_s: float) -> int:
        return int(self.tell(":status:csr? A1DYN", now_s))

    def amplitude(self, from_s: float, over_s: float) -> tuple[float, float]:
        """Return the middle and half the span of the angle in `over_s` from `from_s` on."""
        angles = self.plant.total_angles_deg(np.linspace(from_s, from_s + over_s, 4001))
        return float(angles.max() + angles.min()) / 2.0, float(np.ptp(angles)) / 2.0


def served(amplitude_deg: float, hertz: float) -> float:
    """The size of a sine behind w^2/(s + w)^2."""
    return amplitude_deg / (1.0 + (hertz / PLAIN.servo_bandwidth_hz) ** 2)


def test_a_sine_slews_to_its_amplitude_about_the_position_demand() -> None:
    table = Controller()
    assert table.tell(":con:osc? 1") == "Disable,10.000000,0.100000,Position,Linear"
    table.tell(":con:osc 1,Enable,2.000000,0.1000,Pos,Log")
    assert table.tell(":Con:Osc? 1") == "Enable,2.000000,0.100000,Position,Logarithmic"
    table.tell(":con:osc 1,disab,2.0,0.1,pos,lin")
    table.tell(":mode:pos 1;:dem:pos 1,30")
    table.tell(":dem:osc 1,10.0,2.50,90", 5.0)
    assert table.tell(":DEM:OSC? 1", 5.0) == "10.000000;2.500000;90.000000"
    table.tell(":MODE:SYNT 1", 5.0)
    assert table.tell(":mode? 1", 5.0) == "Synthesis"
    # 2 deg/s to 10 deg: half of it after 2.5 s, all after 5
    assert table.bits(7.4) & (AT_AMPLITUDE | AT_FREQUENCY) == AT_FREQUENCY
    assert table.amplitude(7.3, 0.4)[1] == pytest.approx(served(5.0, 2.5), rel=0.05)
    assert table.bits(10.01) & (AT_AMPLITUDE | AT_FREQUENCY) == AT_AMPLITUDE | AT_FREQUENCY
    assert table.amplitude(12.0, 2.0) == pytest.approx((30.0, served(10.0, 2.5)), rel=1e-5)
    # phase 90 at the start, so a cosine that lags by 2 atan(f/f0)
    at = 2.0 * math.pi * 2.5 * 7.123 + math.pi / 2.0 - 2.0 * math.atan(0.5)
    assert table.plant.total_angle_deg(12.123) == pytest.approx(
        30.0 + served(10.0, 2.5) * math.sin(at), abs=1e-9
    )


@pytest.mark.parametrize(("sweep", "hertz"), [("Lin", 0.5 + 0.25 * 3.0), ("Log", 0.5 * 10.0 ** (0.25 * 3.0))])
def test_a_frequency_sweeps_and_keeps_the_amplitude_of_its_state(sweep: str, hertz: float) -> None:
    table = Controller()
    table.tell(f":con:osc 1,disable,1000,0.25,rate,{sweep}")
    table.tell(":mode:pos 1;:dem:osc 1,6,0.5,0;:mode:synt 1")
    table.tell(":dem:osc 1,6,8,0", 4.0)
    assert not table.bits(7.0) & AT_FREQUENCY
    # the reference turns by the frequency at this moment, with the rate's amplitude kept
    size = 6.0 / (2.0 * math.pi * hertz)
    times = np.linspace(6.9, 7.1, 2001)
    reference = np.array([table.plant._reference(t)[0] for t in times])
    wave = np.column_stack(
        [np.sin(2.0 * math.pi * hertz * (times - 7.0)), np.cos(2.0 * math.pi * hertz * (times - 7.0))]
    )
    (sine, cosine), *_ = np.linalg.lstsq(wave, reference, rcond=None)
    assert math.hypot(sine, cosine) == pytest.approx(size, rel=0.03)
    end_s = 4.0 + (30.0 if sweep == "Lin" else 4.0 * math.log10(16.0))
    assert not table.bits(end_s - 0.1) & AT_FREQUENCY and table.bits(end_s + 0.1) & AT_FREQUENCY
    middle, amplitude = table.amplitude(end_s + 2.0, 1.0)
    assert (middle, amplitude) == pytest.approx((0.0, served(6.0 / (2.0 * math.pi * 8.0), 8.0)), abs=1e-4)


@pytest.mark.parametrize(
    ("limit", "size_deg", "bits"),
    [
        (":lim:rate synt,1,10", 10.0 / (2.0 * math.pi), 1 << 4 | 1 << 5),
        (":lim:acc synt,1,20", 20.0 / (2.0 * math.pi) ** 2, 1 << 2 | 1 << 3),
        (":lim:acc pos,1,20", 9.0, 0),
    ],
)
def test_a_sine_keeps_to_the_limits_of_synthesis(limit: str, size_deg: float, bits: int) -> None:
    table = Controller()
    table.tell(limit)
    table.tell(":con:osc 1,disable,1000,1,pos,lin;:mode:synt 1;:dem:osc 1,9,1,0")
    assert table.amplitude(5.0, 1.0)[1] == pytest.approx(served(size_deg, 1.0), rel=1e-4)
    assert table.bits(5.0) & 0b111100 == bits


def test_a_limited_sine_slews_as_fast_as_any_until_it_is_limited() -> None:
    table = Controller()
    table.tell(":con:osc 1,disable,1,1,pos,lin;:lim:acc synt,1,1000;:dem:osc 1,10,4,0;:mode:synt 1")
    limit = 1000.0 / (8.0 * math.pi) ** 2  # 1.58 deg, reached after 1.58 s at 1 deg/s
    assert table.amplitude(0.9, 0.25)[1] == pytest.approx(served(1.025, 4.0), rel=0.1)
    assert table.amplitude(2.0, 0.25)[1] == pytest.approx(served(limit, 4.0), rel=1e-3)
    # 1 deg at 4 Hz are 632 deg/s2; 1.7 deg are 1074, and 43 deg/s
    assert [table.bits(t) & 0b111100 for t in (1.0, 1.7)] == [0, 1 << 2 | 1 << 3]


def test_a_sine_stays_between_the_stops_of_a_limited_axis() -> None:
    table = Controller(-40.0, 25.0)
    table.tell(":mode:pos 1;:dem:pos 1,20;:con:osc 1,disable,1000,1,pos,lin;:mode:synt 1;:dem:osc 1,9,0.1,0")
    assert table.amplitude(10.0, 10.0) == pytest.approx((20.0, served(5.0, 0.1)), rel=1e-4)


def test_a_limited_axis_that_turned_swings_between_its_stops_where_it_came_to_rest() -> None:
    table = Controller(-40.0, 25.0)
    table.tell(":mode:rate 1;:dem:rate 1,10;:con:osc 1,disable,1000,1,pos,lin;:dem:osc 1,30,0.1,0")
    table.tell(":mode:synt 1", 2.0)
    rest = 10.0 * 2.0  # braking ends as far beyond as the run-up fell short
    assert table.amplitude(10.0, 10.0) == pytest.approx((rest, served(25.0 - rest, 0.1)), rel=1e-3)


@pytest.mark.parametrize(
    "change", [":con:osc 1,disable,1000,1,rate,lin", ":lim:acc synt,1,4200;:dem:osc 1,10,4,0"]
)
def test_a_sine_goes_on_without_a_step_when_its_state_or_its_limit_changes(change: str) -> None:
    table = Controller()
    table.tell(":con:osc 1,disable,1000,1,pos,lin;:lim:acc synt,1,1000;:dem:osc 1,10,4,0;:mode:synt 1")
    before = [table.plant._reference(t)[0] for t in (2.9999, 3.0)]
    table.tell(change, 3.0)
    after = table.plant._reference(3.0001)[0]
    # at most as far as the sine of 1.58 deg goes in 0.1 ms, and the slew of 1000 deg/s
    assert abs(after - before[1]) < abs(before[1] - before[0]) + 0.1


def size_of_reference(table: Controller, at_s: float, hertz: float) -> float:
    """The amplitude of the plant's reference about a moment, by a fit of a sine and a middle over a period."""
    times = at_s + np.linspace(-0.5, 0.5, 2001) / hertz
    angles = np.array([table.plant._reference(t)[0] for t in times])
    turn = 2.0 * math.pi * hertz * (times - at_s)
    wave = np.column_stack(
        [np.sin(turn), np.cos(turn), np.ones(len(turn)), turn * np.sin(turn), turn * np.cos(turn)]
    )
    (sine, cosine, *_), *_ = np.linalg.lstsq(wave, angles, rcond=None)
    return math.hypot(sine, cosine)


@pytest.mark.parametrize("state", ["pos", "rate", "accel"])
def test_amplitude_and_frequency_slew_side_by_side(state: str) -> None:
    table = Controller()
    table.tell(f":con:osc 1,disable,2,0.05,{state},lin;:dem:osc 1,4,3,0;:mode:synt 1")
    table.tell(":dem:osc 1,12,4,0", 10.0)
    # 3 s later: 4 + 2 * 3 of its state at 3 + 0.05 * 3 Hz
    hertz = 3.15
    per_deg = (2.0 * math.pi * hertz) ** ["pos", "rate", "accel"].index(state)
    assert size_of_reference(table, 13.0, hertz) == pytest.approx(10.0 / per_deg, rel=0.01)
    assert table.bits(13.9) & AT_AMPLITUDE == 0 and table.bits(14.1) & AT_AMPLITUDE


def test_a_sine_that_is_stopped_on_its_way_keeps_what_it_has_reached() -> None:
    table = Controller()
    table.tell(":con:osc 1,disable,2,0.5,pos,lin;:dem:osc 1,4,2,0;:mode:synt 1")
    table.tell(":dem:osc 1,10,4,0", 6.0)
    # a second later 6 deg and 2.5 Hz; from there to 6 deg at 2.5 Hz is no way at all
    reached = [table.plant._reference(t)[0] for t in (6.999999, 7.0)]
    table.tell(":dem:osc 1,6,2.5,0", 7.0)
    assert table.plant._reference(7.0)[0] == pytest.approx(reached[1], abs=1e-9)
    # its rate changes by that of the slew and of half a step in frequency (0.02 Hz, 0.75 deg/s) at most
    assert abs(table.plant._reference(7.000001)[0] - 2.0 * reached[1] + reached[0]) <= 2.8e-6
    assert size_of_reference(table, 7.3, 2.5) == pytest.approx(6.0, rel=1e-3)
    assert table.bits(7.01) & (AT_AMPLITUDE | AT_FREQUENCY) == AT_AMPLITUDE | AT_FREQUENCY


def test_synthesis_takes_over_the_sine_of_position_mode_and_begins_anew_from_others() -> None:
    table = Controller()
    table.tell(":con:osc 1,enable,1,1,pos,lin;:dem:osc 1,2,1,0;:mode:pos 1;:dem:pos 1,90")
    table.tell(":mode:synt 1", 5.3)
    assert size_of_reference(table, 6.0, 1.0) == pytest.approx(2.0, rel=1e-3)
    before, after = (table.plant._reference(t)[0] for t in (5.299999, 5.300001))
    assert abs(after - before) < 1e-4
    table.tell(":mode:off 1", 8.0)
    assert table.bits(8.0) & (AT_AMPLITUDE | AT_FREQUENCY) == 0
    table.tell(":mode:synt 1", 12.0)  # 1 deg/s from nothing
    assert size_of_reference(table, 12.8, 1.0) == pytest.approx(0.8, rel=0.02)


def test_an_axis_that_turns_stops_before_it_swings_and_ends_with_another_mode() -> None:
    table = Controller()
    table.tell(":mode:rate 1;:dem:rate 1,100;:dem:osc 1,5,1,0")
    table.tell(":mode:synt 1", 3.0)
    stopped = 100.0 * (3.0 - 50.0 / 4200.0) + 100.0**2 / (2.0 * 4200.0)
    assert table.amplitude(6.0, 1.0) == pytest.approx((stopped, served(5.0, 1.0)), rel=1e-4)
    assert table.tell(":mode:synt 1", 6.0) == "OK"  # once more changes nothing
    assert table.amplitude(7.0, 1.0) == pytest.approx((stopped, served(5.0, 1.0)), rel=1e-4)
    table.tell(":mode:off 1", 8.0)
    assert table.plant.rate_dps(9.0) == pytest.approx(0.0, abs=1e-9)
    assert table.amplitude(9.0, 1.0)[1] == pytest.approx(0.0, abs=1e-9)


def test_an_enabled_oscillator_swings_in_position_mode_and_stops_when_disabled() -> None:
    table = Controller()
    table.tell(":con:osc 1,enable,1000,1,pos,lin;:dem:osc 1,2,1,0;:mode:pos 1;:dem:pos 1,90")
    assert table.amplitude(3.0, 1.0) == pytest.approx((90.0, served(2.0, 1.0)), rel=1e-4)
    table.tell(":con:osc 1,disable,1000,1,pos,lin", 4.0)
    assert table.amplitude(6.0, 1.0) == pytest.approx((90.0, 0.0), abs=1e-6)
    table.tell(":con:osc 1,enable,1000,1,pos,lin;:dem:pos 1,-90", 7.0)
    angles = table.plant.total_angles_deg(np.linspace(7.0, 12.0, 5001))
    assert np.abs(np.diff(angles)).max() < 1.0  # no step when it swings again
    assert table.amplitude(10.0, 1.0)[1] == pytest.approx(served(2.0, 1.0), rel=1e-4)


def test_vectors_are_followed_in_track_mode_until_one_is_late() -> None:
    table = Controller()
    assert table.tell(":dem:svec 1,1.23456,24.6802") == "OK"  # waits for the mode
    assert table.tell(":dem:svec? 1") == "1.234560;24.680200"
    table.tell(":m:t 1,15")
    assert table.tell(":mode? 1", 5.0) == "Track"  # not late before the first
    for k in range(200):
        t = 5.0 + 0.01 * k
        angle, rate = 8.0 * math.sin(t - 5.0), 8.0 * math.cos(t - 5.0)
        table.tell(f":dem:vect 1,{angle:.7f},{rate:.7f},{-angle:.7f}", t)
    assert table.tell(":dem:vec? 1", t).split(";") == [f"{value:.6f}" for value in (angle, rate, -angle)]
    assert table.plant.total_angle_deg(t) == pytest.approx(8.0 * math.sin(t - 5.0 - 2.0 / W), abs=0.01)
    assert table.tell(":mode? 1", t + 0.014) == "Track"
    assert table.tell(":mode? 1", t + 0.016) == "Off"
    assert table.plant.rate_dps(t + 2.0) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    "line",
    [
        ":con:osc 1,maybe,1,1,pos,lin",
        ":con:osc 1,enable,0,1,pos,lin",
        ":con:osc 1,enable,1,1,pos",
        ":con:osc 2,enable,1,1,pos,lin",
        ":dem:osc 1,1,1",
        ":dem:osc 1,nan,1,0",
        ":dem:osc 1,1,-1,0",
        ":dem:vect 1,1,2",
        ":dem:svec 1,0,1001",
        ":dem:vect 1,0,0,4201",
        ":mode:track 1,70000",
        ":mode:synt 1,5",
        ":mode 1",
        ":read:vector? 2",
        ":read:variable? 1999",
        ":read:variable?",
    ],
)
def test_what_cannot_be_is_refused_and_changes_nothing(line: str) -> None:
    table = Controller()
    table.tell(":dem:osc 1,1,2,3")
    assert table.ask(line)[0] != 0
    assert table.tell(":dem:osc? 1") == "1.000000;2.000000;3.000000"
    assert table.tell(":mode? 1") == "Off"


def test_a_rate_that_is_no_sine_at_0_hz_is_refused() -> None:
    table = Controller()
    table.tell(":con:osc 1,disable,1,1,rate,lin")
    assert table.ask(":dem:osc 1,1,0,0")[0] != 0
    assert table.tell(":dem:osc 1,0,0,0") == "OK"


def test_vectors_and_variables_read_what_position_rate_and_acceleration_do() -> None:
    table = Controller()
    table.tell(":mode:rate 1;:dem:rate 1,100")
    states = table.tell(":read:pos? 1;rate? 1;acc? 1", 0.02)
    assert table.tell(":read:vect? 1", 0.02) == states
    assert table.tell(":r:s 1", 0.02) == ";".join(states.split(";")[:2])
    assert table.tell(":r:va? 1082;va? 1083;va? 1176", 0.02) == states


def test_the_limit_of_rate_mode_holds_for_demands_of_a_rate() -> None:
    table = Controller()
    table.tell(":lim:rate rate,1,50")
    assert table.tell(":lim:rate? r,1") == "50.00000"
    assert table.ask(":dem:rate 1,50.1")[0] != 0 and table.tell(":dem:rate 1,-50") == "OK"
