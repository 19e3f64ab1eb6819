"""For all tests: leases and other state stay out of the home of who runs them; property tests know no hurry.

One thread a process, as the Makefile has it: BLAS threads of two workers on two processors wait for one another.
"""

import os
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

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


@pytest.hookimpl(wrapper=True)
def pytest_report_to_serializable() -> Generator[None, Any, Any]:
    """Hostile text has half a surrogate: in a failure's report it would end the worker and hide all failures."""
    return _encodable((yield))


def _encodable(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _encodable(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return type(data)(map(_encodable, data))
    return data.encode("utf-8", "replace").decode() if isinstance(data, str) else data


@pytest.fixture(scope="session", autouse=True)
def state_folder(tmp_path_factory) -> Iterator[None]:
    before = os.environ.get("XDG_STATE_HOME")
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    yield
    if before is None:
        del os.environ["XDG_STATE_HOME"]
    else:
        os.environ["XDG_STATE_HOME"] = before


@pytest.fixture(scope="session")
def s3_endpoint() -> Iterator[str]:
    """A server that talks S3 over HTTP."""
    server = pytest.importorskip("moto.server", reason="no moto[server]")
    storage = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    storage.start()
    host, port = storage.get_host_and_port()
    yield f"http://{host}:{port}"
    storage.stop()


@pytest.fixture
def bucket(s3_endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Any, str]]:
    """The storage and the name of a bucket of the test's own."""
    fsspec = pytest.importorskip("fsspec")
    pytest.importorskip("s3fs", reason="no s3fs: pip install 'gyrobench[scale]'")
    for name, value in (
        ("AWS_ENDPOINT_URL", s3_endpoint),
        ("AWS_ACCESS_KEY_ID", "x"),
        ("AWS_SECRET_ACCESS_KEY", "x"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
        ("GYROBENCH_CACHE", str(tmp_path / "cache")),
    ):
        monkeypatch.setenv(name, value)
    storage = fsspec.filesystem("s3", skip_instance_cache=True)
    name = f"bench-{abs(hash(tmp_path)):x}"
    storage.mkdir(name)
    fsspec.filesystem("s3").invalidate_cache()
    yield storage, name
    type(storage).clear_instance_cache()
