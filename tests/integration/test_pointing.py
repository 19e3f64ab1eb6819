"""A procedure points with a sense of its own: what went over the line, and how far the axis turned, per table."""

import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.control.procedure import Demands, Procedure
from bench.lab.emulated import Plant
from bench.record.benchfile import load_bench_file
from bench.record.recording import read_exchanges

TABLES = {
    "acutrol3000": (rb":demand:deltaposition 1, ?([-+.\deE]+)", "/dev/ttyUSB0"),
    "ideal_atl": (rb"RMO([-+.\d]+)\r\n", "/dev/ttyUSB0"),
}


def point(bench, p):
    bench.table.engage()
    bench.table.point(90.0, sense="positive")
    bench.table.point(30.0, sense="negative")
    bench.table.point(30.0, sense="positive")  # there already: a whole turn
    bench.table.point(20.0, sense="positive")  # the long way
    bench.table.point(350.0)  # the short way, through 0


@pytest.mark.parametrize("driver", TABLES)
def test_a_procedure_points_in_the_sense_it_asks_for(bench, fog_text, tmp_path, driver):
    told, port = TABLES[driver]
    path = tmp_path / "lab.toml"
    assert f'driver = "acutrol3000"\nport = "{port}"' in fog_text
    path.write_text(fog_text.replace('"acutrol3000"', f'"{driver}"') + "[limits]\nmax_rate_dps = 60\n")
    procedure = Procedure(
        "point", "Point", "tests", bench.spin.parameters, point, lambda p: 1.0, lambda p: Demands()
    )
    with bench.lab(load_bench_file(path), Plant()) as lab:
        result = bench.drive(lab.file, tmp_path / "runs", procedure)
    assert result.outcome == "completed", result.reason
    assert bench.problems(result.folder) == []
    sent = b"".join(data for _, way, data in read_exchanges(result.folder, "table") if way == "sent")
    turns = [float(text) for text in re.findall(told, sent)]
    assert np.allclose(turns[:4], [90.0, -60.0, 360.0, 350.0], atol=0.01)
    table = pq.read_table(result.folder / "turntable.parquet")
    angle = np.unwrap(table["angle_deg"].to_numpy(), period=360.0)
    assert angle[-1] - angle[0] == pytest.approx(90.0 - 60.0 + 360.0 + 350.0 - 30.0, abs=0.02)
