# SPDX-License-Identifier: MIT
"""Listens and speaks LCM in pure Python (daemon/WIRE.md; the protocol is LCM's udpm)."""
from __future__ import annotations

import collections
import re
import socket
import struct
import time
import typing
import urllib.parse

from ._library import Error, UsageError, public

ONE_PIECE, FRAGMENT = 0x4C433032, 0x4C433033  # "LC02" and "LC03": LCM's two kinds of datagram
LARGEST_PIECE = 65487  # bytes of a datagram's payload
MOST_UNFINISHED = 64  # messages of several datagrams that are kept while pieces are missing
MOST_BYTES = 32 << 20  # of all these messages together, and so the longest message

Key = typing.Tuple[typing.Any, int, int, int]  # sender, number, size and pieces of a message


# `content` is a decoded message of portmet, or None for another type; `data` are the bytes.
class Message(typing.NamedTuple):
    channel: str
    content: typing.Any
    data: bytes


def _types() -> dict[bytes, typing.Any]:
    from . import types  # made by lcm-gen

    known = [t for t in vars(types).values() if hasattr(t, "_get_packed_fingerprint")]
    return {t._get_packed_fingerprint(): t for t in known}


@public
class Listener:
    """A member of the multicast group of an LCM `url`. Iterating yields every Message whose channel
    matches the regular expression `channels`, until `timeout` seconds pass without one."""

    def __init__(self, url: str = "udpm://239.255.76.67:7667?ttl=0", channels: str = ".*",
                 timeout: float | None = None) -> None:
        try:
            parts = urllib.parse.urlsplit(url)
            ttl = int(urllib.parse.parse_qs(parts.query).get("ttl", ["0"])[0])
            self._group = (parts.hostname or "239.255.76.67", parts.port or 7667)
            self._wanted = re.compile(channels)
        except (ValueError, re.error) as error:
            raise UsageError(f"{url}, channels {channels}: {error}") from None
        if parts.scheme != "udpm":
            raise UsageError(f"{url}: expected udpm://GROUP:PORT")
        self._types = _types()
        self._unfinished: dict[Key, dict[int, bytes]] = {}  # messages with missing pieces
        self._kept = 0  # bytes of these
        self._number = 0
        self.timeout = timeout
        try:
            self._socket = self._open(ttl)
        except OSError as error:
            raise Error(7, f"{url}: {error}") from None

    def _open(self, ttl: int) -> socket.socket:
        s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # others listen at this port, too
        s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        s.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, ttl)
        s.bind(self._group)
        member = socket.inet_aton(self._group[0]) + socket.inet_aton("0.0.0.0")
        s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        return s

    def close(self) -> None:
        self._socket.close()

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publish(self, channel: str, message: typing.Any) -> None:
        """Sends a message: bytes, or an object of a type that lcm-gen made."""
        data = message if isinstance(message, bytes) else message.encode()
        body = channel.encode() + b"\0" + data
        head = struct.pack(">II", ONE_PIECE, self._number)
        if len(body) > LARGEST_PIECE:
            raise UsageError(f"a message of {len(body)} bytes, at most {LARGEST_PIECE} can be sent")
        self._number = (self._number + 1) % (1 << 32)
        self._socket.sendto(head + body, self._group)

    def receive(self, timeout: float | None = None) -> Message | None:
        """Returns the next message, or None after `timeout` seconds (None: waits forever)."""
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = None if end is None else max(0.0, end - time.monotonic())
            self._socket.settimeout(left)
            try:
                datagram, sender = self._socket.recvfrom(65536)
            except (TimeoutError, BlockingIOError):
                return None
            body = self._join(datagram, sender)
            if body is None or b"\0" not in body:
                continue
            channel, data = body.split(b"\0", 1)
            name = channel.decode(errors="replace")
            if self._wanted.fullmatch(name):
                return Message(name, self._decode(data), data)

    def __iter__(self) -> typing.Iterator[Message]:
        while (message := self.receive(self.timeout)) is not None:
            yield message

    def _decode(self, data: bytes) -> typing.Any:
        kind = self._types.get(data[:8])
        try:
            return None if kind is None else kind.decode(data)
        except (ValueError, struct.error, MemoryError, OverflowError):
            return None

    def _join(self, datagram: bytes, sender: typing.Any) -> bytes | None:
        """Returns the channel and the payload of a message once all its datagrams are there."""
        if len(datagram) < 8:
            return None
        magic, number = struct.unpack_from(">II", datagram)
        if magic == ONE_PIECE:
            return datagram[8:]
        if magic != FRAGMENT or len(datagram) < 20:
            return None
        size, _, which, count = struct.unpack_from(">IIHH", datagram, 8)
        key, piece = (sender, number, size, count), datagram[20:]
        if which >= count or size > MOST_BYTES:
            return None
        pieces = self._unfinished.setdefault(key, {})
        self._kept += len(piece) - len(pieces.get(which, b""))
        pieces[which] = piece
        whole = len(pieces) == count
        if whole:
            self._forget(key)
        while self._kept > MOST_BYTES or len(self._unfinished) > MOST_UNFINISHED:
            self._forget(next(iter(self._unfinished)))
        body = b"".join(pieces[i] for i in range(count)) if whole else b""
        return body if whole and len(body) == size else None

    def _forget(self, key: Key) -> None:
        self._kept -= sum(map(len, self._unfinished.pop(key).values()))
