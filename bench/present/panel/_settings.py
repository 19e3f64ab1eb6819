"""Where the panel looks, who may open it, and what of that cannot be."""

from __future__ import annotations

import ipaddress
import socket
import ssl
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.campaign.queue import BenchQueue
from bench.control.operators import OperatorsFile
from bench.present.panel._access import LOCAL_NAMES
from bench.present.panel._benches import Benches
from bench.present.panel._desk import Desk
from bench.present.panel._folders import RunsFolder
from drivers.base.errors import ConfigurationError

_SHORTEST_TOKEN = 16


@dataclass(frozen=True)
class PanelSettings:
    """Where the panel looks and who may open it."""

    runs: Path
    host: str = "127.0.0.1"
    port: int = 8765
    token: str | None = None
    benches: tuple[Path, ...] = ()
    """Bench files: on these benches runs can be started."""
    campaigns: Path | None = None
    """The folder of campaign files; None: beside each bench file."""
    operators: Path | None = None
    """The file of those who may sign in; None: nobody signs in, names are typed."""
    certificate: Path | None = None
    key: Path | None = None
    tls_elsewhere: bool = False
    """A proxy before the panel does TLS."""

    def desks(self, benches: Benches) -> list[Desk]:
        """Return the desk of every bench; ConfigurationError for a file that is none, for two of one name."""
        queues = [BenchQueue(self.runs, path) for path in self.benches]
        names = [queue.bench for queue in queues]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise ConfigurationError(
                "two bench files of one name",
                where="--bench",
                found=", ".join(twice),
                expected="a name of its own for every bench ([bench] name)",
            )
        return [Desk(queue, benches, self.campaigns or queue.bench_file.parent) for queue in queues]

    def check(self) -> None:
        """Raise ConfigurationError for a folder that is none, an open door without a token, a port in use."""
        if self.runs.exists() and not self.runs.is_dir():
            raise ConfigurationError(
                "this is no runs folder",
                where=str(self.runs),
                expected="the folder that `gyrobench run --runs` or `campaign run --out` writes to",
            )
        if self.token is not None and (len(self.token) < _SHORTEST_TOKEN or not self.token.isascii()):
            raise ConfigurationError(
                "a token that is easy to guess",
                where="--token",
                found=f"{len(self.token)} characters",
                expected=f"at least {_SHORTEST_TOKEN} letters and digits",
                remedy="GYROBENCH_PANEL_TOKEN=$(openssl rand -hex 16) gyrobench panel ...",
            )
        if self.token is None and self.operators is None and not is_local(self.host):
            raise ConfigurationError(
                "a panel that others can reach needs a token or operators",
                where=f"--host {self.host}",
                expected="--operators, or --token or GYROBENCH_PANEL_TOKEN in the environment",
                remedy="GYROBENCH_PANEL_TOKEN=$(openssl rand -hex 16) gyrobench panel ...",
            )
        self._check_sign_in()
        self.desks(Benches(RunsFolder(self.runs)))
        try:
            with socket.create_server((self.host, self.port), reuse_port=False):
                pass
        except (OSError, OverflowError) as error:
            raise ConfigurationError(
                "the panel cannot listen there",
                where=f"{self.host}:{self.port}",
                found=str(error),
                expected="an address of this machine and a free port",
                remedy="name others with --host and --port",
            ) from error

    def _check_sign_in(self) -> None:
        """Raise ConfigurationError for operators who cannot sign in safely, and a certificate that is none."""
        if self.certificate is not None:
            tls(self.certificate, self.key)
        elif self.key is not None:
            raise ConfigurationError(
                "a key without its certificate", where="--key", expected="--certificate too"
            )
        if self.operators is None:
            return
        if not OperatorsFile(self.operators).all():
            raise ConfigurationError(
                "nobody may sign in",
                where=str(self.operators),
                remedy=f"gyrobench operators add NAME --role configure --file {self.operators}",
            )
        if self.certificate is None and not self.tls_elsewhere and not is_local(self.host):
            raise ConfigurationError(
                "passwords would cross the network for everybody to read",
                where=f"--host {self.host}",
                expected="--certificate and --key, or a proxy before the panel that does TLS",
                remedy="--tls-elsewhere says that there is such a proxy",
            )


def tls(certificate: Path, key: Path | None) -> dict[str, Any]:
    """Return what the server is told of TLS; ConfigurationError for files that cannot be used."""
    try:
        ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(certificate, key, _no_passphrase)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        raise ConfigurationError(
            "the certificate cannot be used",
            where=", ".join(str(path) for path in (certificate, key) if path is not None),
            found=str(error),
            expected="a certificate with its chain and its private key without a passphrase, both PEM",
        ) from error
    return {"ssl_certfile": str(certificate), **({"ssl_keyfile": str(key)} if key is not None else {})}


def _no_passphrase() -> str:
    raise ValueError("the key has a passphrase, which nobody could type at a start")


def is_local(host: str) -> bool:
    """Return whether only this machine reaches that address."""
    with suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host in LOCAL_NAMES
