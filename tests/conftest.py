"""For all tests: leases and other state stay out of the home of who runs them; property tests know no hurry.

One thread a process, as the Makefile has it: BLAS threads of two workers on two processors wait for one another.
"""

import os
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# A busy machine makes no property false: no deadline an example. CI tries the same examples every time; a
# developer's machine goes on looking for new ones.
settings.register_profile(
    "gyrobench",
    deadline=None,
    derandomize="CI" in os.environ,
    suppress_health_check=[HealthCheck.too_slow],
    print_blob=True,
)
settings.load_profile("gyrobench")


@pytest.fixture(scope="session", autouse=True)
def state_folder(tmp_path_factory) -> Iterator[None]:
    before = os.environ.get("XDG_STATE_HOME")
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    yield
    if before is None:
        del os.environ["XDG_STATE_HOME"]
    else:
        os.environ["XDG_STATE_HOME"] = before
