"""What tests of chamber drivers share: a day of a chamber, its record read back, and a record of any bytes."""

from collections.abc import Sequence

import numpy as np

from drivers.kit.instruments import Rest


def check_a_day(chamber, wire, plant, auxiliary_c, fastest, stop):
    """A ramp while it stands, a start, a step, then safe. `fastest`: the ramp that a step is told as; `stop`:
    bytes that a halt sends at once.
    """
    chamber.set_temperature(40.0, 5.0)
    assert plant.demands[-1] == (40.0, 5.0, 5.0, False)
    chamber.start()
    assert plant.demands[-1] == (40.0, 5.0, 5.0, True)
    state = chamber.state()
    assert (state.air_temp_c, state.set_point_c, state.auxiliary_c) == (40.0, 40.0, auxiliary_c)
    chamber.set_temperature(-45.0)
    assert plant.demands[-1] == (-45.0, fastest, fastest, True)
    assert chamber.alarms() == []
    before = len(wire.sent)
    chamber.halt()
    assert stop in wire.sent[before:]
    chamber.make_safe()
    assert plant.demands[-1] == (23.0, fastest, fastest, False)
    assert chamber.read_rest() == Rest(True, running=False, set_point_c=23.0)


def check_record(chamber, wire, plant, decode, shown_c, damage):
    """Poll it three times and read its record; return the columns. `damage`: bytes of the second answer, and
    what they become: that poll is counted and left out.
    """
    chamber.start()
    seen = []
    for air in (20.04, -12.36, 40.0):
        plant.air = air
        wire.clock.sleep(1.0)
        seen.append(chamber.state())
    assert [state.air_temp_c for state in seen] == shown_c
    chamber.halt()
    sound, counts = decode(iter(wire.exchanges))
    assert counts == {"polls": 3, "damaged": 0}
    assert sound["time_ns"].dtype == np.int64
    np.testing.assert_array_equal(sound["air_temp_c"], shown_c)
    exchanges = [(at, way, data.replace(*damage)) for at, way, data in wire.exchanges]
    columns, counts = decode(iter(exchanges))
    assert counts == {"polls": 3, "damaged": 1}
    np.testing.assert_array_equal(columns["air_temp_c"], [shown_c[0], shown_c[2]])
    return sound


def check_any_record(decode, chunks: Sequence[tuple[str, bytes]]):
    """A record of any bytes decodes and has as many polls as times."""
    columns, _ = decode([(at, way, data) for at, (way, data) in enumerate(chunks)])
    assert len(columns["air_temp_c"]) == len(columns["time_ns"])
