"""Columns through Arrow buffers give the values of pyarrow's own conversion, whatever type, slice or chunks."""

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from bench.record.recording._tables import from_arrow, to_arrow

DTYPES = [np.bool_, np.uint8, np.uint16, np.int32, np.int64, np.float32, np.float64]


@settings(max_examples=80, deadline=None)
@given(
    column=st.sampled_from(DTYPES).flatmap(lambda dtype: hnp.arrays(dtype, st.integers(0, 40))),
    start=st.integers(0, 40),
    stop=st.integers(0, 40),
    cut=st.integers(0, 40),
)
def test_values_survive_both_ways(column, start, stop, cut):
    ours, theirs = to_arrow(column), pa.array(column)
    assert ours.type == theirs.type
    assert pa.array(column).to_numpy(zero_copy_only=False).tobytes() == from_arrow(ours).tobytes()
    part = from_arrow(theirs[start:stop])
    assert part.tobytes() == column[start:stop].tobytes()
    assert part.dtype == column.dtype
    chunked = pa.chunked_array([theirs[:cut], theirs[cut:]])
    assert from_arrow(chunked).tobytes() == column.tobytes()


def test_nulls_and_texts_are_refused():
    with pytest.raises(ValueError, match="1 nulls"):
        from_arrow(pa.array([1, None]))
    with pytest.raises(ValueError, match="not of numbers"):
        from_arrow(pa.array(["a"]))


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_column_of_no_chunks_is_empty_and_one_of_one_is_not_copied(dtype):
    kind = to_arrow(np.zeros(1, dtype)).type
    empty = from_arrow(pa.chunked_array([], type=kind))
    assert empty.shape == (0,) and empty.dtype == dtype
    column = np.ones(5, dtype)
    found = from_arrow(pa.chunked_array([to_arrow(column)]))
    assert found.tolist() == column.tolist()
    assert dtype is np.bool_ or np.shares_memory(found, column)
