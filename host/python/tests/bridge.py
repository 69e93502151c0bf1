"""A bridge that follows the control contract and moves nothing: one owner, requests told apart by client and number."""

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

TOKEN = "5e" * 32
STATUS = {200: None, 503: ("link_lost", "busy", "ended"), 504: ("not_confirmed",)}


class Bridge:
    """Serves on a free port of this machine; what it was asked stands in ``requests``."""

    def __init__(self):
        self.owner = None
        self.mode = "released"
        self.floor_n = 2.0
        self.requests = []
        self.answers = {}
        # Reasons for the next requests to be refused with, in order.
        self.refuse = []
        # How many answers are lost on the way.
        self.lose = 0
        self.frames = []
        self.half_line = b""
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self.address = f"127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()

    def answer(self, request):
        """HTTP status and answer of a request; the same one gets the same answer and moves nothing."""
        key = request["client"], request["request"]
        if key not in self.answers:
            self.answers[key] = self._carry_out(request)
        why = self.answers[key]["why"]
        status = next((status for status, names in STATUS.items() if names and why in names), 409 if why else 200)
        return status, self.answers[key]

    def _carry_out(self, request):
        self.requests.append(request)
        client, action = request["client"], request["action"]
        why = self.refuse.pop(0) if self.refuse else None
        if action == "take_over" or request.get("take_over"):
            self.owner = client
        elif self.owner not in (None, client):
            why = "wrong_owner"
        if why is None:
            self.owner = None if action == "yield" else client
            self.mode = {"hold": "hold", "release": "released"}.get(action, self.mode)
            self.floor_n = request.get("floor_n", self.floor_n)
        return {
            "client": client,
            "request": request["request"],
            "action": action,
            "outcome": "refused" if why else "done",
            "why": why,
            "message": f"found {why}, expected otherwise" if why else "done",
            "owner": self.owner,
            "took_ms": 1.5,
        }

    def status(self):
        return {
            "owner": self.owner,
            "requested": self.mode,
            "mode": self.mode,
            "state": "STICK",
            "line_n": 4.25,
            "floor_n": self.floor_n,
            "ceiling_n": 20.0,
            "link": "embedded",
            "is_connected": True,
            "status_age_ms": 3.0,
            "faults": [],
            "host_faults": [],
            "frames": 12,
        }

    def _handler(bridge):
        class Handler(BaseHTTPRequestHandler):
            def log_message(self, *_):
                pass

            def tell(self, status, document):
                body = json.dumps(document).encode()
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def do_GET(self):
                if self.path == "/status":
                    self.tell(200, bridge.status())
                elif self.path == "/frames":
                    self.send_response(200)
                    self.end_headers()
                    for frame in bridge.frames:
                        self.wfile.write(json.dumps(frame).encode() + b"\n")
                    self.wfile.write(bridge.half_line)
                else:
                    self.tell(404, {"message": "expected /status, /frames or /control"})

            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"]))
                if self.headers["Authorization"] != f"Bearer {TOKEN}":
                    return self.tell(401, {"message": "found another token, expected the one in the file"})
                if len(body) > 4096:
                    return self.tell(413, {"message": "found more than 4096 bytes"})
                try:
                    status, answer = bridge.answer(json.loads(body))
                except (KeyError, ValueError) as error:
                    return self.tell(400, {"message": f"found no request ({error})"})
                if bridge.lose:
                    bridge.lose -= 1
                    self.close_connection = True
                    return self.connection.close()
                return self.tell(status, answer)

        return Handler
