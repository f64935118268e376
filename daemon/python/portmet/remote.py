"""A scene that `portmetd serve` steps elsewhere, with the methods of Scene (daemon/WIRE.md, "Control")."""
import ctypes
import json
import os
import secrets
import socket
import struct
import time

import numpy

from ._library import Error
from .listener import FRAGMENT, ONE_PIECE, Listener
from .scene import Ledger, Port, Subsystem

PATIENCE = 10.0  # s without a reply, after which the service counts as silent
ASK_FIRST, ASK_LAST = 0.02, 1.0  # s until a request is repeated; each time takes twice as long
USAGE, SILENT = 2, 8  # codes of portmetd


def _attach_filter(sock, channel):
    """Lets the kernel drop what is not on the channel, so that the messages of the run cost nothing. Pieces
    of long messages pass. The program is one of classic BPF; it sees the datagram behind 8 bytes of UDP."""
    name = channel.encode() + b"\0"
    tests = [(0x20, 16 + i, name[i:i + 4]) for i in range(0, len(name) - 3, 4)]  # ld: words
    tests += [(0x30, 16 + i, name[i:i + 1]) for i in range(len(name) // 4 * 4, len(name))]  # ldb: bytes
    keep, drop = 2 * len(tests) + 3, 2 * len(tests) + 4  # positions of the two ends
    program = [(0x20, 0, 0, 8), (0x15, keep - 2, 0, FRAGMENT), (0x15, 0, drop - 3, ONE_PIECE)]
    for load, offset, value in tests:
        program.append((load, 0, 0, offset))
        program.append((0x15, 0, drop - len(program) - 1, int.from_bytes(value, "big")))
    program += [(0x06, 0, 0, 0xFFFFFFFF), (0x06, 0, 0, 0)]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *step) for step in program))
    attach = getattr(socket, "SO_ATTACH_FILTER", 26)
    sock.setsockopt(socket.SOL_SOCKET, attach, struct.pack("HL", len(program), ctypes.addressof(code)))


class Remote:
    """The scene `name` that `portmetd serve` offers at the LCM `url`. Opening it begins a run without a last
    step, held at the scene's initial state; `record` names its recording in the folder of the service.
    Arrays follow every step, as those of a Scene do."""

    def __init__(self, name, *, url="udpm://239.255.76.67:7667?ttl=0", record="", timeout=PATIENCE):
        from . import types  # made by lcm-gen

        self.name, self._record, self._timeout = name, record, timeout
        self._type = types.control_t
        self._reply_type = types.control_reply_t
        self._client, self._nonce, self._ticket = secrets.randbits(62) + 1, 0, 0
        self._sender = f"python-{os.getpid()}@{socket.gethostname()}"[:60]
        self._link = Listener(url, channels=name + "_REPLY")
        if len(name + "_REPLY") < 60:
            _attach_filter(self._link._socket, name + "_REPLY")
        self._describe()
        self._running = False
        self._begin(None)

    def _ask(self, kind, whole=True, **fields):
        """Repeats a request until it is done, or, unless `whole`, until there is any reply."""
        self._nonce += 1
        request = self._type()
        request.client, request.nonce, request.kind = self._client, self._nonce, kind
        request.sender = self._sender
        for field, value in fields.items():
            setattr(request, field, value)
        begun, pause, again = time.monotonic(), ASK_FIRST, 0.0
        while True:
            now = time.monotonic()
            if now >= again:
                request.ticket = self._ticket
                self._link.publish(self.name + "_CONTROL", request)
                again, pause = now + pause, min(2 * pause, ASK_LAST)
            message = self._link.receive(again - now)
            reply = None if message is None else message.content
            if type(reply) is not self._reply_type or (reply.client, reply.nonce) != (self._client, self._nonce):
                if now > begun + self._timeout:
                    raise Error(SILENT, f"no service of scene {self.name} answers within {self._timeout} s")
                continue
            begun = now
            if reply.kind == reply.AGAIN:
                again = again if self._ticket == reply.ticket and reply.last < self._nonce else 0.0
                self._ticket = reply.ticket
                if reply.last >= self._nonce:  # somebody forged a request of this client
                    self._nonce = request.nonce = reply.last + 1
            elif reply.kind == reply.REFUSED or reply.code != 0:
                raise Error(reply.code, reply.text)
            elif reply.kind == reply.DONE or not whole:
                return reply

    def _describe(self):
        text, page, pages = "", 0, 1
        while page < pages:
            reply = self._ask(self._type.QUERY, page=page)
            text, page, pages = text + reply.text, page + 1, reply.pages
        self.description = d = json.loads(text)
        groups = [(s["name"], *g) for s in d["subsystems"] for g in s["groups"]]
        self.variables = [f"{s}.{g}[{i}]" for s, g, _, size in groups for i in range(size)]
        self.units = [unit for _, _, unit, size in groups for _ in range(size)]
        self.input_names = [name for name, _ in d["inputs"]]
        self.state = numpy.zeros(len(self.variables))
        n, m = len(d["subsystems"]), len(d["ports"])
        self.energy, self.entropy, self.bulk_energy, self.bulk_entropy = numpy.zeros((4, n))
        self.flux = numpy.zeros((m, 2, 2))  # energy and entropy into both ends of each port
        self.inputs = numpy.full(len(self.input_names), numpy.nan)
        self._sent = self.inputs.copy()
        self.ledger = Ledger(numpy.zeros(len(Ledger.NAMES)))
        self.subsystems = {s["name"]: Subsystem(self, i, s["name"]) for i, s in enumerate(d["subsystems"])}
        self.ports = {p["name"]: Port(p["name"], tuple(p["ends"]), f) for p, f in zip(d["ports"], self.flux)}
        self.steps, self.time, self.dt, self.planned = 0, 0.0, d["dt"], d["steps"]

    def _take(self, reply):
        if reply.nz != len(self.state):
            raise Error(USAGE, f"scene {self.name} is too large: its replies have no state")
        self.steps, self.time = reply.step, reply.time
        self.state[:] = reply.z
        self.energy[:], self.entropy[:] = reply.part_energy, reply.part_entropy
        self.bulk_energy[:], self.bulk_entropy[:] = reply.bulk_energy, reply.bulk_entropy
        self.flux[:, :, 0] = numpy.reshape(reply.energy_flux, (-1, 2))
        self.flux[:, :, 1] = numpy.reshape(reply.entropy_flux, (-1, 2))
        now = {name: getattr(reply, name) for name in ("energy", "entropy", "outside_energy", "outside_entropy",
                                                       "energy_residual", "entropy_residual", "violations")}
        if reply.step == 0:
            now.update(first_energy=reply.energy, first_entropy=reply.entropy, energy_drift=0, entropy_fall=0)
        for name, value in now.items():
            self.ledger._values[Ledger.NAMES.index(name)] = value
        return self

    def _live(self):
        return {} if numpy.isnan(self.inputs).any() or not len(self.inputs) else {
            "nlive": len(self.inputs), "live": self.inputs.tolist()}

    def _begin(self, state):
        z = {} if state is None else {"nz": len(state), "z": state.tolist()}
        if self._running:
            reply = self._ask(self._type.RESET, held=True, **z, **self._live())
        else:
            reply = self._ask(self._type.START, whole=False, held=True, record=self._record, **z, **self._live())
        self._running = True
        self._sent = self.inputs.copy()
        return self._take(reply)

    def __getitem__(self, name):
        return self.subsystems[name]

    def __repr__(self):
        return f"<remote portmet scene {self.name}: {', '.join(self.subsystems)}; step {self.steps}>"

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def step(self, count=1):
        """Takes `count` steps. Raises Error at the first failure."""
        if self._live() and (self.inputs != self._sent).any():
            self._ask(self._type.SET, **self._live())
            self._sent = self.inputs.copy()
        return self._take(self._ask(self._type.ADVANCE, steps=count)) if count > 0 else self

    def run(self):
        """Steps to the end of the scene."""
        return self.step(max(0, self.planned - self.steps))

    def restart(self, state=None):
        """Begins again at step 0, at `state` [variables] or at the scene's initial state."""
        if state is not None:
            state = numpy.ascontiguousarray(state, dtype=float)
            if state.shape != self.state.shape:
                raise ValueError(f"a state of {state.shape}, expected {self.state.shape}")
        return self._begin(state)

    def set_input(self, name, value):
        """Sets the live input of this name (input_names), or all of a group, from the next step on."""
        chosen = [i for i, n in enumerate(self.input_names) if name in (n, n.rpartition("[")[0])]
        if not chosen:
            raise KeyError(name)
        self.inputs[chosen] = value

    def close(self):
        """Ends the run; the service stays."""
        if self._running:
            self._running = False
            self._ask(self._type.STOP)
        self._link.close()
