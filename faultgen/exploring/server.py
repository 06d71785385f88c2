"""The server of the page. It listens on this machine only, and writes nothing.

A page of another address must not use it either: requests must name this machine as their host, so
that a foreign name that is made to point here (DNS rebinding) is refused, and a request that a
browser sends for another page is refused by its origin.

    server = ExploreServer("puma560")
    print(server.url)
    server.serve_forever()
"""

from __future__ import annotations

import errno
import json
import socket
import sys
from collections.abc import Callable
from functools import cached_property
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from faultgen.errors import InputError, MethodFailed, SimulationFailed, one_line, what_it_says
from faultgen.exploring.choice import Choice, Subject, read_choice
from faultgen.exploring.cycles import Cycles
from faultgen.exploring.offer import offer
from faultgen.exploring.signals import answer
from faultgen.report.page import page, script
from faultgen.report.scene import Scene
from faultgen.simulation.operation import AS_PROGRAMMED

HOST = "127.0.0.1"
"""The address on which the server listens: that of this machine for itself."""

_NAMES = (HOST, "localhost")  # hosts that a request may name
_SHARED = ("robot.js", "motion.js")  # with reports
_SCRIPTS = (*_SHARED, "charts.js", "explore.js")
_RULES = (  # what the page may load: nothing from elsewhere
    "default-src 'none'; script-src 'self'; style-src 'unsafe-inline'; img-src data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class ExploreServer(ThreadingHTTPServer):
    """Serves the page of one robot and task, and the signals that it asks for."""

    daemon_threads = True

    def __init__(self, robot: str, task: str | None = None, port: int = 0) -> None:
        """Load the robot, plan its task and open the port.

        Args:
            robot: Name of the robot, or path of its MJCF file or folder.
            task: Name of the task, or path of a task file. Default: pick_and_place, or the first
                task of a robot that does not have it.
            port: Port; 0 for any free one.

        Raises:
            InputError: There is no such robot or task, the robot cannot do the task, or the port
                cannot be used.
        """
        self.subject = Subject(robot, task)
        self.cycles = Cycles(self.subject)
        try:
            self.planned = self.cycles.shared(AS_PROGRAMMED)
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            self.cycles.close()
            raise InputError(_unusable(port, error)) from None
        except BaseException:
            self.cycles.close()
            raise

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server_port}/"

    @cached_property
    def scene(self) -> Scene:
        """The picture of the robot."""
        return Scene(self.subject.robot, self.planned.position)

    @cached_property
    def verdicts(self) -> Any:
        """The isolators; their import takes a second, which the page need not wait for."""
        from faultgen.exploring.verdict import Verdicts

        return Verdicts(self.cycles)

    def server_close(self) -> None:
        """Close the port, and end the thread that simulates."""
        super().server_close()
        self.cycles.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing if a browser has hung up; else as usual.

        Args:
            request: The connection.
            client_address: Its other end.
        """
        if not isinstance(sys.exception(), (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


def _unusable(port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        reason = "another program uses it"
    elif error.errno in (errno.EACCES, errno.EPERM):
        reason = "this user may not use it"
    else:
        reason = one_line(error.strerror or error)
    return f"port {port}: {reason}; give another one, or leave --port out for any free one"


class _Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server: ExploreServer
    protocol_version = "HTTP/1.1"
    server_version = "faultgen"
    sys_version = ""

    def setup(self) -> None:
        """Send small answers at once."""
        super().setup()
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing.

        Args:
            format: A text with places for values.
            args: The values.
        """

    def do_GET(self) -> None:
        """Answer a request."""
        if not self._is_own():
            self._send_json({"error": "only pages of this machine may ask"}, HTTPStatus.FORBIDDEN)
            return
        parts = urlsplit(self.path)
        if parts.path == "/":
            html = page("explore.html", title=self.server.subject.robot.name, scripts=_SCRIPTS)
            self._send(html.encode(), "text/html; charset=utf-8")
        elif parts.path.lstrip("/") in (*_SCRIPTS, "plotly.js"):
            self._send(_script(parts.path.lstrip("/")), "text/javascript; charset=utf-8", keep=True)
        elif parts.path in _ANSWERS:
            told = dict(parse_qsl(parts.query))
            try:
                self._send_json(_ANSWERS[parts.path](self.server, told))
            except (InputError, SimulationFailed, MethodFailed) as error:
                self._send_json({"error": one_line(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
            except ConnectionError:
                raise
            except Exception as error:  # the page shows it; the server goes on
                self._send_json({"error": what_it_says(error)}, HTTPStatus.INTERNAL_SERVER_ERROR)
        else:
            self._send_json({"error": f"there is no {parts.path}"}, HTTPStatus.NOT_FOUND)

    def _is_own(self) -> bool:
        """Whether the request names this machine, and comes from no page of another address."""
        own = {f"{name}:{self.server.server_port}" for name in _NAMES}
        origin = self.headers.get("Origin")
        if self.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            return False
        return self.headers.get("Host") in own and (
            origin is None or urlsplit(origin).netloc in own
        )

    def _send_json(self, told: dict[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(told).encode(), "application/json", status)

    def _send(
        self, body: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK, keep: bool = False
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "max-age=3600" if keep else "no-store")
        self.send_header("Content-Security-Policy", _RULES)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.end_headers()
        self.wfile.write(body)


def _script(name: str) -> bytes:
    """A script of the page; plotly.js is that of the package plotly."""
    if name == "plotly.js":
        return resources.files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()
    if name in _SHARED:
        return script(name).encode()
    return Path(__file__).with_name("page").joinpath(name).read_bytes()


def _state(server: ExploreServer, told: dict[str, str]) -> dict[str, Any]:
    scene, position = server.scene, server.planned.position
    return {**offer(server.subject), "scene": scene.told(), "poses": scene.poses(position)}


def _choice(server: ExploreServer, told: dict[str, str]) -> Choice:
    """What is chosen, checked."""
    choice = read_choice(told)
    server.subject.check(choice)
    return choice


def _signals(server: ExploreServer, told: dict[str, str]) -> dict[str, Any]:
    return answer(server.cycles, _choice(server, told), exact=told.get("exact") == "1")


def _poses(server: ExploreServer, told: dict[str, str]) -> dict[str, Any]:
    found = server.cycles.exact(_choice(server, told))
    return server.scene.poses(found.arrays["joint_position"])


def _verdict(server: ExploreServer, told: dict[str, str]) -> dict[str, Any]:
    found: dict[str, Any] = server.verdicts.verdict(_choice(server, told))
    return found


_ANSWERS: dict[str, Callable[[ExploreServer, dict[str, str]], dict[str, Any]]] = {
    "/state": _state,
    "/signals": _signals,
    "/poses": _poses,
    "/verdict": _verdict,
}
