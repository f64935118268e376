# SPDX-License-Identifier: MIT
"""A client of `portmetd serve` in plain LCM: begins a run that is held at its start, takes single steps, and
prints the energy after each. It needs only Python 3 and the message types:

    lcm-gen -p portmet.lcm
    python3 advance.py double_pendulum 5

advance.c does the same in C. With the package portmet it is shorter: portmet.Remote (daemon/LIBRARY.md).
"""
import secrets
import socket
import struct
import sys

from portmet import control_reply_t, control_t

GROUP, PORT, ONE_PIECE = "239.255.76.67", 7667, 0x4C433032  # "LC02": a message in one datagram

scene = sys.argv[1] if len(sys.argv) > 1 else "double_pendulum"
count = int(sys.argv[2]) if len(sys.argv) > 2 else 5
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # others listen at this port, too
link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
link.bind((GROUP, PORT))
link.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(GROUP) + bytes(4))
request = control_t()
request.client, request.sender, request.held = secrets.randbits(62) + 1, "advance", True


def receive(wait):
    """Returns the reply to the present request, or None after `wait` seconds."""
    link.settimeout(wait)
    try:
        while True:
            datagram = link.recv(65536)
            if struct.unpack_from(">I", datagram)[0] == ONE_PIECE:
                channel, payload = datagram[8:].split(b"\0", 1)
                if channel.decode() == scene + "_REPLY":
                    reply = control_reply_t.decode(payload)
                    if (reply.client, reply.nonce) == (request.client, request.nonce):
                        return reply
    except TimeoutError:
        return None


def ask(kind, steps=0):
    """Sends a request again and again until it is done, or accepted."""
    wait = 0.02
    request.nonce, request.kind, request.steps = request.nonce + 1, kind, steps
    while True:
        head = struct.pack(">II", ONE_PIECE, request.nonce & 0xFFFFFFFF)
        link.sendto(head + (scene + "_CONTROL").encode() + b"\0" + request.encode(), (GROUP, PORT))
        reply = receive(wait)
        wait = min(2 * wait, 1.0)
        if reply is None:
            continue
        request.ticket = reply.ticket
        if reply.kind == reply.REFUSED:
            sys.exit("refused: " + reply.text)
        if reply.kind not in (reply.AGAIN, reply.PENDING):
            return reply


ask(control_t.START)
for _ in range(count):
    r = ask(control_t.ADVANCE, 1)
    print(f"step {r.step}, {r.time:.1f} s: {r.energy:.9f} J")
ask(control_t.STOP)
