"""The panel's side of `_worker`: asks it one thing at a time, ends it when it takes too long or nobody asks."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from contextlib import suppress
from typing import Any

_TIMEOUT_S = 300.0
_IDLE_S = 120.0
_LONGEST = 64 << 20


class Workshop:
    """A worker that is started when it is needed. Its answers are dictionaries, `problem` in one that failed."""

    def __init__(self) -> None:
        self._one = asyncio.Lock()
        self._process: asyncio.subprocess.Process | None = None
        self._rest: asyncio.TimerHandle | None = None

    async def ask(self, job: str, **asked: Any) -> dict[str, Any]:
        """Return the answer to a request; what became of a worker that died or hung is its `problem`."""
        async with self._one:
            if self._rest is not None:
                self._rest.cancel()
            try:
                return await asyncio.wait_for(self._ask(json.dumps({"job": job} | asked)), _TIMEOUT_S)
            except TimeoutError:
                self.stop()
                return {"problem": f"reading the run took more than {_TIMEOUT_S:g} s"}
            except (OSError, ValueError) as error:
                self.stop()
                return {"problem": f"the process that reads runs ended: {error}"}
            finally:
                self._rest = asyncio.get_running_loop().call_later(_IDLE_S, self.stop)

    def stop(self) -> None:
        """End the worker; the next request starts another."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()
            self._process = None

    async def _ask(self, line: str) -> dict[str, Any]:
        if self._process is None or self._process.returncode is not None:
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "bench.present.panel._worker"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.DEVNULL,
                limit=_LONGEST,
                env=os.environ | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
            )
        reader, writer = self._process.stdout, self._process.stdin
        assert reader is not None and writer is not None
        writer.write(line.encode() + b"\n")
        await writer.drain()
        answer = await reader.readline()
        if not answer.endswith(b"\n"):
            raise ValueError("no answer")
        found: dict[str, Any] = json.loads(answer)
        return found
