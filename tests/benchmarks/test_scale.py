"""The arithmetic of docs/scale.md, worked out by hand from round unit costs."""

from benchmarks._marks import fill
from benchmarks.scale import Costs, table


def test_a_million_runs_from_round_costs():
    found = Costs(
        sample=1e-6,
        frame=2e-7,
        arrival_bytes=10.0,
        table_bytes=20.0,
        indexed_run=1e-4,
        opening=0.005,
        models={"grey_box": 0.5, "lstm": 15.0, "hybrid": 4.5},
        diagnosis=3.6,
        rehearsed_hour=2.0,
        panel_share=None,
    )
    rows = {line.split(" | ")[0].strip("| "): line for line in table(found).splitlines()}
    assert "1 us a sample and port" in rows["recording"] and "0.02 % of a processor" in rows["recording"]
    # 1.4 million samples a gyro: 50.4, 14 and 28 MB; 2,000 gyros at 3,600 bytes/s; 92.4 MB x 2 x 1,000,000
    assert "50 MB raw, its index up to 14 MB" in rows["bytes"]
    assert "its table 28 MB" in rows["bytes"]
    assert "7.2 MB/s raw" in rows["bytes"] and "up to 185 TB for all runs" in rows["bytes"]
    # 2.8 million frames at 0.2 us: 0.56 s; 560,000 s are 156 h
    assert "0.6 s a run, 156 h of one processor" in rows["decoding"]
    assert "100 us to index a run" in rows["catalogue"] and "| 100 s anew" in rows["catalogue"]
    # 111,111 units at 20 s: 617 h, 38.6 h on sixteen
    assert "20 s for all 3 on nine runs, 20 s of it the two networks" in rows["models of a unit"]
    assert "111,111 units: 617 h of one processor, 38.6 h on a cluster of 16" in rows["models of a unit"]
    assert "62,500 diagnoses: 62 h of one processor" in rows["gap diagnosis"]
    # 3,888,889 h of bench time at 2 s an hour: 2,160 h
    assert "3,888,889 h of bench time: 2,160 h of one processor, 135.0 h on" in rows["rehearsal"]
    assert "panel" not in rows


def test_a_table_is_put_between_its_marks_and_nowhere_else(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- a -->\nold\n<!-- /a -->\n<!-- b -->\nstays\n<!-- /b -->\n")
    fill(page, "a", r"new \1" + "\n")
    assert page.read_text() == ("before\n<!-- a -->\nnew \\1\n<!-- /a -->\n<!-- b -->\nstays\n<!-- /b -->\n")
