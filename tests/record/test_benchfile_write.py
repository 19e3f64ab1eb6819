"""A bench file written as text reads back equal."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.record.benchfile import bench_file_text, load_bench_file

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("name", ["lab.toml", "demo.toml"])
def test_examples_read_back_equal(name, tmp_path):
    file = load_bench_file(EXAMPLES / name)
    copy = tmp_path / "copy.toml"
    copy.write_text(bench_file_text(file), encoding="utf-8")
    assert load_bench_file(copy).model_dump() == file.model_dump()


@settings(deadline=None, max_examples=50)
@given(st.text(st.characters(codec="utf-8", exclude_characters="\x7f"), min_size=1, max_size=20))
def test_any_name_survives(tmp_path_factory, name):
    file = load_bench_file(EXAMPLES / "demo.toml")
    named = file.model_copy(update={"bench": file.bench.model_copy(update={"name": name})})
    copy = tmp_path_factory.mktemp("bench") / "copy.toml"
    copy.write_text(bench_file_text(named), encoding="utf-8", newline="")
    assert load_bench_file(copy).bench.name == name
