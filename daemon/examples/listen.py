# SPDX-License-Identifier: MIT
"""A listener in plain LCM: prints the fluxes of every step of a running scene, and the ledger. It needs only Python 3
and the message types:

    lcm-gen -p portmet.lcm
    python3 listen.py double_pendulum

listen.c does the same in C.
"""
import socket
import struct
import sys

from portmet import command_t, flux_t, ledger_t

GROUP, PORT = "239.255.76.67", 7667
ONE_PIECE, FRAGMENT = 0x4C433032, 0x4C433033  # "LC02" and "LC03": LCM's two kinds of datagram

def open_socket():
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # others listen at this port, too
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    s.bind((GROUP, PORT))
    member = socket.inet_aton(GROUP) + socket.inet_aton("0.0.0.0")
    s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    return s

def messages(s):
    """Yields (channel, payload). A large message comes in several datagrams."""
    pieces = {}  # (sender, number): what has come so far
    while True:
        datagram, sender = s.recvfrom(65536)
        magic, number = struct.unpack_from(">II", datagram)
        if magic == ONE_PIECE:
            channel, payload = datagram[8:].split(b"\0", 1)
            yield channel.decode(), payload
        elif magic == FRAGMENT:
            size, offset, which, count = struct.unpack_from(">IIHH", datagram, 8)
            whole = pieces.setdefault((sender, number), {})
            whole[which] = datagram[20:]
            if len(whole) == count:
                del pieces[sender, number]
                channel, payload = b"".join(whole[i] for i in range(count)).split(b"\0", 1)
                yield channel.decode(), payload

scene = sys.argv[1]
for channel, payload in messages(open_socket()):
    if channel.startswith(scene + "_FLUX_"):
        flux = flux_t.decode(payload)
        if flux.round == 0:  # the fluxes in a message are means over the step before
            for i in range(flux.nend):
                print(f"{channel} step {flux.step}: end {i}: "
                      f"{flux.energy_flux[i]:+.6e} W {flux.entropy_flux[i]:+.6e} W/K")
    elif channel == scene + "_LEDGER":
        ledger = ledger_t.decode(payload)
        print(f"{channel} step {ledger.step}: {ledger.energy:.9f} J {ledger.entropy:.9f} J/K, "
              f"{ledger.violations} violations")
    elif channel == scene + "_COMMAND" and command_t.decode(payload).kind != command_t.REFUSE:
        break  # END or ABORT
