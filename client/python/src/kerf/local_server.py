"""A server on this machine, for as long as a program wants one."""

from __future__ import annotations

import collections
import json
import os
import shutil
import subprocess
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kerf.client import Client
from kerf.errors import NotFoundError, UnavailableError

if TYPE_CHECKING:
    from typing import Self

#: Lines of the log that are kept for an error to show.
_KEPT_LINES = 20
#: How long a server may take to end its sessions.
_STOP_TIMEOUT_S = 10.0


class LocalServer:
    """Runs `kerf-server serve` on a free port; a context manager, which ends it."""

    def __init__(self, program: str | Path = "kerf-server", *, settings: Mapping[str, object] | None = None) -> None:
        """Starts it, and waits until it listens.

        Args:
            program: The server, a path or a name to be looked for.
            settings: As `kerf-server serve --print-config` lists them: `{"session.max_sessions": 2}`.

        Raises:
            NotFoundError: There is no such program.
            UnavailableError: It ended before it listened; the message has the end of its log.
        """
        found = shutil.which(program)
        if found is None:
            raise NotFoundError(f"no program {str(program)!r}", field="program", limit="a kerf-server")
        given = {"log.format": "json", **(settings or {})}
        flags = [f"--set={name}={_as_setting(value)}" for name, value in given.items()]
        self._process = subprocess.Popen(
            [found, "serve", "--listen", "127.0.0.1:0", *flags], stderr=subprocess.PIPE, text=True
        )
        #: Host and port.
        self.address = self._listening_address()

    @classmethod
    def of_environment(cls, settings: Mapping[str, object] | None = None) -> Self:
        """Starts the program that `KERF_SERVER_PROGRAM` names, or `kerf-server` on the path."""
        return cls(os.environ.get("KERF_SERVER_PROGRAM", "kerf-server"), settings=settings)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def client(self, *, timeout_s: float = 60.0) -> Client:
        """A connection to it."""
        return Client(self.address, timeout_s=timeout_s)

    @property
    def is_running(self) -> bool:
        """Whether it has not ended, by `stop` or by itself."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Ends its sessions and it."""
        self._process.terminate()
        try:
            self._process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _listening_address(self) -> str:
        kept: collections.deque[str] = collections.deque(maxlen=_KEPT_LINES)
        log = self._process.stderr
        assert log is not None
        for line in log:
            kept.append(line)
            fields = json.loads(line).get("fields", {}) if line.startswith("{") else {}
            if fields.get("message") == "listening":
                # What it says from now on has to be read, or it would wait to say it.
                threading.Thread(target=collections.deque, args=(log, 0), daemon=True).start()
                return str(fields["address"])
        raise UnavailableError(f"the server ended with status {self._process.wait()}: {''.join(kept)}")


def _as_setting(value: object) -> str:
    """A value as `--set` reads it: `True` is Python's word, `true` the server's."""
    return str(value).lower() if isinstance(value, bool | np.bool_) else str(value)
