"""A client for a running bridge: ``gripline run --serve ADDRESS``.

Everybody may read status and frames; to move the gripper one needs the token, which stands in a file that only its owner can
read. A request has a number that is never used twice; it is repeated once under the same number when no answer comes, and the
bridge then answers again without doing anything again. Nothing moves unless one of the seven actions is asked for.
Limits: plain HTTP without encryption, for the same machine or a trusted network; proxies and redirections are not followed,
because the token would go with them.
"""

from __future__ import annotations

import http.client
import json
import os
import re
import threading
import time
from pathlib import Path
from typing import Any, Iterator
from urllib.parse import urlsplit

from ._gripline import GriplineError

_NAME = re.compile(r"[A-Za-z0-9._:/@-]{1,64}")


class ControlError(GriplineError):
    """A request was not executed.

    ``why`` is the reason's name, ``answer`` the bridge's whole answer or None, ``owner`` who owns the gripper or None.
    Each reason of the bridge has a class of its own here.
    """

    why: str = "failed"

    def __init__(self, message: str, why: str | None = None, answer: dict[str, Any] | None = None) -> None:
        super().__init__(message)
        if why is not None:
            self.why = why
        self.answer = answer
        self.owner: str | None = (answer or {}).get("owner")


class Unreachable(ControlError):
    """There is no bridge at the address, or it did not answer in time. The request may have been executed: see status()."""

    why = "unreachable"


class NoToken(ControlError):
    """The file with the token cannot be read, or holds none."""

    why = "no_token"


class BadToken(ControlError):
    """The bridge knows another token."""

    why = "bad_token"


class BadRequest(ControlError):
    """The bridge cannot read the request."""

    why = "bad_request"


class WrongOwner(ControlError):
    """Another client owns the gripper: wait until it yields, or take it over."""

    why = "wrong_owner"


class Latched(ControlError):
    """Latched faults forbid a release: look at them, acknowledge, release again."""

    why = "latched"


class Inhibited(ControlError):
    """The release-inhibit input forbids a release."""

    why = "inhibited"


class LinkLost(ControlError):
    """The microcontroller is not connected. Nothing is sent when it is back: ask again then."""

    why = "link_lost"


class NotConfirmed(ControlError):
    """It was sent repeatedly, but no status of the microcontroller confirmed it."""

    why = "not_confirmed"


class Restarted(ControlError):
    """The microcontroller restarted before it confirmed; nothing is repeated by itself."""

    why = "restarted"


class Holding(ControlError):
    """Only possible while the gripper is released."""

    why = "holding"


class Touched(ControlError):
    """Only possible while nothing touches the fingertip."""

    why = "touched"


class StillActive(ControlError):
    """Faults are still latched because their cause is still there."""

    why = "still_active"


class OutOfRange(ControlError):
    """A force outside the allowed range."""

    why = "out_of_range"


class Refused(ControlError):
    """The microcontroller refused its settings."""

    why = "refused"


class Overtaken(ControlError):
    """A newer request took its place."""

    why = "overtaken"


class NoCamera(ControlError):
    """There is no camera to take new pictures."""

    why = "no_camera"


class Busy(ControlError):
    """Too many requests wait: ask again in a moment."""

    why = "busy"


class Ended(ControlError):
    """The run is over."""

    why = "ended"


_BY_NAME = {error.why: error for error in ControlError.__subclasses__()}
_BY_STATUS = {400: BadRequest, 401: BadToken, 413: BadRequest}


def token_path() -> Path:
    """Default path of this user's token."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "gripline" / "token"


class Client:
    """Speaks to the bridge at ``address`` under the name ``client``.

    address: as it was given to ``--serve``, ``127.0.0.1:9187`` or ``http://127.0.0.1:9187``.
    client: who owns the gripper while this client does; 1 to 64 of A-Z a-z 0-9 . _ : / @ -.
    token: the token itself, or token_file: where it stands; by default ``token_path()``. Read only when it is needed.
    timeout_s: how long to wait for an answer, seconds; the bridge takes up to 4.
    """

    def __init__(
        self,
        address: str,
        *,
        client: str = "python",
        token: str | None = None,
        token_file: str | os.PathLike[str] | None = None,
        timeout_s: float = 6.0,
    ) -> None:
        parts = urlsplit(address if "//" in address else f"//{address}")
        try:
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if parts.scheme not in ("", "http") or not host or port is None or parts.path not in ("", "/"):
            raise ValueError(f"address: found '{address}', expected HOST:PORT as given to --serve, such as 127.0.0.1:9187")
        if not _NAME.fullmatch(client):
            raise ValueError(f"client: found '{client}', expected 1 to 64 of A-Z a-z 0-9 . _ : / @ -")
        if not timeout_s > 0:
            raise ValueError(f"timeout_s: found {timeout_s}, expected a positive number")
        self._host, self._port = host, port
        self._client = client
        self._token = token
        self._token_file = Path(token_file) if token_file is not None else None
        self._timeout_s = timeout_s
        self._number = 0
        self._lock = threading.Lock()

    def __repr__(self) -> str:
        return f"Client('{self._host}:{self._port}', client='{self._client}')"

    def status(self) -> dict[str, Any]:
        """The gripper's present state.

        owner, requested and mode ('hold', 'released' or None), state, line_n, floor_n and ceiling_n (newtons), link,
        is_connected, status_age_ms, faults (number, name, active, latched, what_to_do), host_faults and frames.
        """
        status, body = self._ask("GET", "/status", None, {})
        if status != 200:
            raise self._error(status, body)
        return self._object(body)

    def frames(self, *, timeout_s: float = 10.0) -> Iterator[dict[str, Any]]:
        """The frames from now on, one dict each as in ``gripline run --json``, until the run ends.

        A reader that is too slow misses frames: see the gaps in 'frame'. Raises Unreachable when for timeout_s none comes.
        """
        connection = http.client.HTTPConnection(self._host, self._port, timeout=timeout_s)
        try:
            try:
                connection.request("GET", "/frames")
                response = connection.getresponse()
                if response.status != 200:
                    raise self._error(response.status, response.read())
                while True:
                    line = response.readline()
                    # The end of the run; half a line is what a run that was killed leaves.
                    if not line.endswith(b"\n"):
                        return
                    if line.strip():
                        yield self._object(line)
            except (OSError, http.client.HTTPException) as error:
                raise self._unreachable(error) from error
        finally:
            connection.close()

    def hold(self, *, take_over: bool = False) -> dict[str, Any]:
        """Holds: the grip closes and follows the load. Returns the bridge's answer once the microcontroller confirmed it."""
        return self._act("hold", take_over)

    def release(self, *, take_over: bool = False) -> dict[str, Any]:
        """Releases the object. Refused while faults are latched."""
        return self._act("release", take_over)

    def acknowledge(self, *, take_over: bool = False) -> dict[str, Any]:
        """Acknowledges the latched faults: a person has looked at them."""
        return self._act("acknowledge", take_over)

    def rezero(self, *, take_over: bool = False) -> dict[str, Any]:
        """Takes new pictures of the untouched fingertip. Refused while the gripper holds or something touches."""
        return self._act("rezero", take_over)

    def set_floor(self, floor_n: float, *, take_over: bool = False) -> dict[str, Any]:
        """Sets the minimum grip force, newtons."""
        return self._act("set_floor", take_over, floor_n=float(floor_n))

    def take_over(self) -> dict[str, Any]:
        """Takes the gripper over from its owner. Nothing moves."""
        return self._act("take_over", False)

    def yield_(self) -> dict[str, Any]:
        """Gives up ownership, so that others may own it. Nothing moves."""
        return self._act("yield", False)

    def _act(self, action: str, take_over: bool, **more: float) -> dict[str, Any]:
        request = {"client": self._client, "request": self._next_number(), "action": action, **more}
        if take_over:
            request["take_over"] = True
        try:
            body = json.dumps(request, allow_nan=False).encode()
        except ValueError:
            raise ValueError(f"floor_n: found {more.get('floor_n')}, expected a finite number of newtons") from None
        headers = {"Authorization": f"Bearer {self._secret()}", "Content-Type": "application/json"}
        try:
            status, answer = self._ask("POST", "/control", body, headers)
        except Unreachable as error:
            if isinstance(error.__cause__, ConnectionRefusedError):
                raise
            # Whether it arrived is not known; under the same number it is done once at most.
            status, answer = self._ask("POST", "/control", body, headers)
        if status != 200:
            raise self._error(status, answer)
        return self._object(answer)

    def _next_number(self) -> int:
        with self._lock:
            # Begins with a clock's, so that a new process never repeats an old one's.
            self._number = max(self._number + 1, time.time_ns() // 1_000)
            return self._number

    def _secret(self) -> str:
        if self._token is not None:
            token, place = self._token, "token"
        else:
            path = self._token_file or token_path()
            place = str(path)
            try:
                token = path.read_text(encoding="ascii", errors="replace")
            except OSError as error:
                raise NoToken(
                    f"{place}: {error.strerror or error}, expected the token of the bridge: run as the user who runs the bridge, or "
                    "give token or token_file"
                ) from error
        token = token.strip()
        if not re.fullmatch(r"[!-~]+", token):
            raise NoToken(f"{place}: found no token, expected one word of letters and digits")
        return token

    def _ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection(self._host, self._port, timeout=self._timeout_s)
        try:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            return response.status, response.read()
        except (OSError, http.client.HTTPException) as error:
            raise self._unreachable(error) from error
        finally:
            connection.close()

    def _unreachable(self, error: Exception) -> Unreachable:
        return Unreachable(
            f"{self._host}:{self._port}: {error or type(error).__name__}, expected a running bridge: start `gripline run --serve "
            f"{self._host}:{self._port}`"
        )

    def _object(self, body: bytes) -> dict[str, Any]:
        try:
            found = json.loads(body)
        except ValueError:
            found = None
        if not isinstance(found, dict):
            raise ControlError(
                f"{self._host}:{self._port}: found an answer that is no JSON object, expected that of a bridge: is it one?"
            )
        return found

    def _error(self, status: int, body: bytes) -> ControlError:
        try:
            answer = json.loads(body)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            answer = {}
        why = answer.get("why")
        message = answer.get("message") or f"the bridge answered with HTTP status {status}, expected 200"
        error = _BY_NAME.get(why) if isinstance(why, str) else _BY_STATUS.get(status)
        return (error or ControlError)(str(message), why if isinstance(why, str) else None, answer or None)
