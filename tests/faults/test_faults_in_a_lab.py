"""Faults of a plant file in an emulated lab: what the bench meets, and that the seed says it all."""

import itertools
import json

import pytest

from bench.lab.emulated import EmulatedLab, Plant, load_plant
from bench.record.benchfile import load_bench_file
from drivers.base.errors import BenchError, ConfigurationError, LinkLost
from drivers.base.virtual_clock import VirtualClock
from drivers.frames import FrameDecoder, load_family
from drivers.kit.link import Link
from drivers.kvh import KvhDecoder
from simulators.faults import Fault

BENCH = """
[bench]
name = "fault bench"
latitude_deg = 39.10
[table]
driver = "acutrol3000"
port = "socket://127.0.0.1:9878"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB2"
[[gyro]]
name = "fog_1"
driver = "kvh1750"
port = "/dev/ttyUSB1"
rate_hz = 100
axis = "x"
unit = "FOG-001"
[[gyro]]
name = "ring_1"
driver = "rlg2t"
port = "/dev/ttyUSB3"
baudrate = 115200
rate_hz = 100
axis = "x"
unit = "RLG-001"
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "lab.toml"
    path.write_text(BENCH)
    return load_bench_file(path)


class Ears:
    """Keeps what arrives, and when."""

    def __init__(self):
        self.data, self.marks = b"", []

    def received(self, data, arrival_s):
        self.data += data
        self.marks.append((len(self.data), round(arrival_s * 1e9)))

    def sent(self, data, time_s):
        pass


def opened(lab, clock, name, ears=None):
    return Link(lab.ports[name], clock, name=name, tap=ears)


def listen(file, plant, name, seconds, step_s=0.5):
    """Return what port `name` of a lab says within `seconds`, heard every `step_s`."""
    with EmulatedLab(file, Plant.model_validate(plant)) as lab:
        clock, ears = VirtualClock(lab.clock_url), Ears()
        link = opened(lab, clock, name, ears)
        for _ in range(round(seconds / step_s)):
            clock.sleep(step_s)
        link.close()
        clock.close()
        struck = lab.perform({"act": "struck"})["struck"]
    return ears, struck


def ring_decoder():
    return FrameDecoder(load_family("rlg2t"), rate_hz=100.0, axes="x")


def decoded(decoder, data):
    batch = decoder.feed(data)
    return batch.columns["counter"].tolist(), decoder.counts


def test_the_same_seed_gives_the_same_damage_and_another_seed_another(file):
    faults = [
        {"port": "fog_1", "kind": "flip", "rate_per_h": 2000.0},
        {"port": "fog_1", "kind": "drop", "rate_per_h": 2000.0, "count": 5},
        {"port": "fog_1", "kind": "delay", "rate_per_h": 500.0, "duration_s": 1.5},
    ]
    plant = {"seed": 7, "delivery_s": 1.0, "fault": faults}
    first, struck = listen(file, plant, "fog_1", 30.0)
    again, struck_again = listen(file, plant, "fog_1", 30.0)
    assert struck and struck == struck_again
    assert again.data == first.data and again.marks == first.marks
    other, struck_other = listen(file, plant | {"seed": 8}, "fog_1", 30.0)
    assert [entry["time_s"] for entry in struck_other] != [entry["time_s"] for entry in struck]
    assert other.data != first.data


def test_each_wrong_crc_costs_one_frame_and_shows_in_the_counter(file):
    plant = {"fault": [{"port": "ring_1", "kind": "bad_check", "at_s": [3.0, 5.0, 9.5]}]}
    ears, struck = listen(file, plant, "ring_1", 12.0)
    counter, counts = decoded(ring_decoder(), ears.data)
    # sample k ends at (k + 1) / 100 s; its frame is out 1.3 ms later
    assert [k for k in range(max(counter) + 1) if k not in counter] == [299, 499, 949]
    assert sum(counts.rejected.values()) == 3
    assert [entry["kind"] for entry in struck] == ["bad_check"] * 3


def test_a_counter_jump_is_not_a_loss(file):
    plant = {
        "delivery_s": 1.0,
        "fault": [{"port": "fog_1", "kind": "counter_jump", "at_s": [4.0], "count": 9}],
    }
    ears, _ = listen(file, plant, "fog_1", 8.0)
    clean, _ = listen(file, {"delivery_s": 1.0}, "fog_1", 8.0)
    jumped, _ = decoded(KvhDecoder(nominal_rate_hz=1000.0), ears.data)
    smooth, _ = decoded(KvhDecoder(nominal_rate_hz=1000.0), clean.data)
    assert len(jumped) == len(smooth)
    steps = [(b - a) % 128 for a, b in itertools.pairwise(jumped)]
    assert sorted(set(steps)) == [1, 10] and steps.count(10) == 1


@pytest.mark.parametrize("ppm", [10_000.0, -10_000.0])
def test_a_gyro_whose_clock_is_off_by_one_percent_sends_that_many_samples(file, ppm):
    ears, _ = listen(file, {"clock_error_ppm": {"ring_1": ppm}}, "ring_1", 20.0)
    counter, _ = decoded(ring_decoder(), ears.data)
    assert abs(len(counter) - 2000 * (1 + ppm * 1e-6)) <= 1


@pytest.mark.parametrize("name", ["fog_1", "table"])  # a terminal and a socket
def test_a_port_vanishes_is_refused_and_comes_back(file, name):
    fault = {"port": name, "kind": "vanish", "at_s": [5.0], "duration_s": 3.0}
    with EmulatedLab(file, Plant.model_validate({"delivery_s": 1.0, "fault": [fault]})) as lab:
        clock = VirtualClock(lab.clock_url)
        link = opened(lab, clock, name)
        clock.sleep(4.9)
        with pytest.raises(LinkLost) as lost:
            clock.sleep(10.0)
        assert name in str(lost.value)
        assert 5.0 <= clock.now() < 5.1
        link.close()
        with pytest.raises(ConfigurationError, match="cannot be opened"):
            opened(lab, clock, name)
        clock.sleep(8.1 - clock.now())
        ears = Ears()
        link = opened(lab, clock, name, ears)
        if name == "table":
            link.write(b"*IDN?\r\n")
            assert b"Acutrol3000" in link.read_until(b"01.000-a", 1.0)
        clock.sleep(3.0)
        link.close()
        clock.close()
    if name == "fog_1":
        counter, counts = decoded(KvhDecoder(nominal_rate_hz=1000.0), ears.data)
        assert len(counter) > 2000 and not any(counts.rejected.values())


def test_a_fault_can_be_put_in_by_a_stage_hand(file):
    with EmulatedLab(file, Plant()) as lab:
        clock = VirtualClock(lab.clock_url)
        link = opened(lab, clock, "table")
        clock.sleep(1.0)
        lab.perform({"act": "fault", "port": "table", "kind": "refuse", "text": "Brake Engaged"})
        clock.sleep(1.0)
        link.write(b":mode:rate 1\r\n")
        assert b"Brake Engaged" in link.read_until(b"Engaged", 1.0)
        link.write(b":mode:rate 1\r\n")
        assert link.read_until(b"OK", 1.0).endswith(b"OK")
        with pytest.raises(BenchError, match="no such port") as refusal:
            lab.perform({"act": "fault", "port": "tabel", "kind": "refuse"})
        assert "table" in str(refusal.value)
        with pytest.raises(BenchError, match="plant file"):
            lab.perform({"act": "fault", "port": "fog_1", "kind": "vanish", "duration_s": 1.0})
        link.close()
        clock.close()


def test_a_trip_that_the_table_does_not_know_is_refused_before_the_lab_opens(file):
    faults = (Fault(port="table", kind="trip", text="rate trp", at_s=(100.0,)),)
    with pytest.raises(ConfigurationError, match=r"text 'rate trp'.*one of.*rate trip"):
        EmulatedLab(file, Plant(fault=faults))


def test_a_plant_file_with_faults_reads_and_bad_ones_name_the_key(tmp_path, file):
    path = tmp_path / "plant.toml"
    path.write_text(
        'seed = 3\n[[fault]]\nport = "chamber"\nkind = "weaken"\nat_s = [600.0]\nfactor = 0.1\n'
        '[[fault]]\nport = "fog_1"\nkind = "flip"\nrate_per_h = 5\n'
    )
    plant = load_plant(path)
    assert json.loads(plant.model_dump_json())["fault"][0]["factor"] == 0.1
    path.write_text('[[fault]]\nport = "chamber"\nkind = "weaken"\nat = [600.0]\n')
    with pytest.raises(ConfigurationError, match=r"fault\.0\.at"):
        load_plant(path)
    with pytest.raises(BenchError, match="'weaken'"):
        EmulatedLab(
            file, Plant.model_validate({"fault": [{"port": "table", "kind": "weaken", "at_s": [1.0]}]})
        )
