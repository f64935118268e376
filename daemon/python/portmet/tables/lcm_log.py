# SPDX-License-Identifier: MIT
"""LCM logs, decoded with the types of a .lcm file: channel.field is a column, and a message is a row.

A log is a sequence of events: the sync word 0xEDA1DA01, number, time (us), lengths of channel and message, channel,
message, all big-endian. A message begins with the fingerprint of its type, which says by which type it is decoded."""
import math
import re
import struct

import numpy

from table import DATA, MOST_COLUMNS, Refused, Run, say

SYNC, HEADER = 0xEDA1DA01, struct.Struct(">IqqII")
PRIMITIVE = {"int8_t": "b", "int16_t": "h", "int32_t": "i", "int64_t": "q", "byte": "B", "boolean": "b", "float": "f",
             "double": "d", "string": None}
TOGETHER = 0.1  # of the shortest period of a channel: messages that are so close belong to one row
OWN_TIMES = ("utime", "timestamp")  # fields that hold the sender's time
UNITS_OF_TIME = (1, 1e-3, 1e-6, 1e-9)
AGREE = 0.01  # relative difference of a duration by the log and by the sender
TOKEN = re.compile(r"\s+|//[^\n]*|/\*.*?\*/|([A-Za-z_][\w.]*|-?[\d.]+(?:[eE][-+]?\d+)?|0[xX][\da-fA-F]+|[{}\[\];,=])", re.DOTALL)


# --- types ---

class Type:
    """A message type: fields are (name, type, dims), and dims are (is variable, size as it is written)."""

    def __init__(self, name):
        self.name, self.fields = name, []


def _hash_byte(v, c):
    signed = v - (1 << 64) if v >> 63 else v
    return (((v << 8) ^ (signed >> 55)) + (c - 256 if c > 127 else c)) & 0xFFFFFFFFFFFFFFFF


def _hash_text(v, text):
    v = _hash_byte(v, len(text))
    for c in text.encode():
        v = _hash_byte(v, c)
    return v


def _base_hash(own):
    v = 0x12345678
    for name, kind, dims in own.fields:
        v = _hash_text(v, name)
        if kind in PRIMITIVE:
            v = _hash_text(v, kind)
        v = _hash_byte(v, len(dims))
        for variable, size in dims:
            v = _hash_text(_hash_byte(v, int(variable)), size)
    return v


def fingerprint(own, types, parents=()):
    """The number with which messages of a type begin, as lcm-gen computes it."""
    if own.name in parents:
        return 0
    v = _base_hash(own)
    for _, kind, _ in own.fields:
        if kind not in PRIMITIVE:
            v += fingerprint(types[kind], types, (*parents, own.name))
    v &= 0xFFFFFFFFFFFFFFFF
    return ((v << 1) + (v >> 63)) & 0xFFFFFFFFFFFFFFFF


class _Parser:
    def __init__(self, path, text):
        self.path, self.tokens, at = path, [], 0
        while at < len(text):
            found = TOKEN.match(text, at)
            if not found:
                raise Refused(DATA, f"{path}:{text.count(chr(10), 0, at) + 1}: unexpected {text[at]!r}")
            if found[1]:
                self.tokens.append((found[1], text.count("\n", 0, at) + 1))
            at = found.end()
        self.tokens.append(("", text.count("\n") + 1))
        self.at = 0

    def take(self, *expected):
        token, line = self.tokens[self.at]
        if token == "" or (expected and token not in expected):
            wanted = " or ".join(repr(e) for e in expected) or "more"
            raise Refused(DATA, f"{self.path}:{line}: expected {wanted}, found {token or 'the end of the file'!r}")
        self.at += 1
        return token

    def next(self):
        return self.tokens[self.at][0]

    def parse(self, types):
        package = ""
        while self.next():
            if self.take("package", "struct") == "package":
                package = self.take()
                self.take(";")
                continue
            own = Type(f"{package}.{self.take()}" if package else self.take())
            self.take("{")
            while self.next() != "}":
                if self.next() == "const":
                    while self.take() != ";":
                        pass
                    continue
                kind = self.take()
                kind = kind if kind in PRIMITIVE or "." in kind or not package else f"{package}.{kind}"
                while True:
                    name, dims = self.take(), []
                    while self.next() == "[":
                        self.take()
                        size = self.take()
                        dims.append((not size[0].isdigit(), size))
                        self.take("]")
                    own.fields.append((name, kind, dims))
                    if self.take(",", ";") == ";":
                        break
            self.take("}")
            types[own.name] = own


def read_types(paths):
    """Returns the types of .lcm files by their fingerprints, and by their names."""
    types = {}
    for path in paths:
        try:
            with open(path, encoding="utf-8", errors="replace") as file:
                _Parser(path, file.read()).parse(types)
        except OSError as error:
            raise Refused(4, f"{path}: cannot be read: {error.strerror}") from None
    for own in types.values():
        for name, kind, dims in own.fields:
            if kind not in PRIMITIVE and kind not in types:
                raise Refused(DATA, f'{paths[0]}: field {own.name}.{name} has the type "{kind}", which no file of --types holds')
            before = [field for field, of, _ in own.fields if of in ("int8_t", "int16_t", "int32_t", "int64_t")]
            for variable, size in dims:
                if variable and size not in before:
                    raise Refused(DATA, f'{paths[0]}: field {own.name}.{name}: "{size}" is no whole number of the type')
    return {fingerprint(own, types): own for own in types.values()}, types


# --- messages ---

class _Damaged(Exception):
    pass


class _Decoder:
    def __init__(self, data, types, out):
        self.data, self.types, self.out, self.at = data, types, out, 8

    def number(self, code):
        size = struct.calcsize(">" + code)
        if self.at + size > len(self.data):
            raise _Damaged
        self.at += size
        return struct.unpack_from(">" + code, self.data, self.at - size)[0]

    def decode(self, own, prefix, depth=0):
        if depth > 32:
            raise _Damaged
        sizes = {}
        for name, kind, dims in own.fields:
            shape = [sizes.get(size, 0) if variable else int(size) for variable, size in dims]
            if any(n < 0 for n in shape) or math.prod(shape) > len(self.data):
                raise _Damaged
            for i in range(math.prod(shape)):
                place, rest = "", i
                for n in reversed(shape):
                    place, rest = f"_{rest % n}{place}", rest // n
                if kind == "string":
                    length = self.number("i")
                    if length < 1 or self.at + length > len(self.data):
                        raise _Damaged
                    self.at += length
                elif kind in PRIMITIVE:
                    value = self.number(PRIMITIVE[kind])
                    if not dims:
                        sizes[name] = value
                    self.out[f"{prefix}{name}{place}"] = value
                else:
                    self.decode(self.types[kind], f"{prefix}{name}{place}.", depth + 1)


def events(path, data):
    """Yields time (us), channel and message of each event. Says where a log is cut or damaged, and ends there."""
    at, count = 0, 0
    while at + HEADER.size <= len(data):
        sync, _, time, name_length, length = HEADER.unpack_from(data, at)
        end = at + HEADER.size + name_length + length
        if sync != SYNC or end > len(data):
            break
        middle = at + HEADER.size + name_length
        yield time, data[at + HEADER.size:middle].decode("utf-8", "replace"), data[middle:end]
        at, count = end, count + 1
    if at < len(data):
        say(f"{path}: cut or damaged after {count} messages; leaves out the last {len(data) - at} bytes")


def read(path, type_paths):
    if not type_paths:
        raise Refused(DATA, f"{path}: an LCM log needs the types of its messages: make a dataset of it by portmet-train import "
                            "--log LOG --types FILE.lcm --units NAME=UNIT,... -o DATA.h5")
    by_fingerprint, types = read_types(type_paths)
    with open(path, "rb") as file:
        data = file.read()
    channels, unknown, damaged = {}, {}, {}
    for time, channel, message in events(path, data):
        own = by_fingerprint.get(int.from_bytes(message[:8], "big")) if len(message) >= 8 else None
        if own is None:
            unknown[channel] = unknown.get(channel, 0) + 1
            continue
        fields = {}
        decoder = _Decoder(message, types, fields)
        try:
            decoder.decode(own, "")
            if decoder.at != len(message):
                raise _Damaged
        except _Damaged:
            damaged[channel] = damaged.get(channel, 0) + 1
            continue
        channels.setdefault((re.sub(r"\s+", "_", channel), own.name), []).append((time * 1e-6, fields))
    for counts, why in ((unknown, "whose fingerprint is that of no type in the files of --types"),
                        (damaged, "which end too early or too late for their type")):
        for channel, count in counts.items():
            say(f"{path}: leaves out {count} messages of {channel}, {why}")
    if not channels:
        raise Refused(DATA, f"{path}: no message has a type of {' '.join(type_paths)}")
    return _join(path, channels)


def _own_times(channels):
    """Returns the times by the field with the sender's time that all messages have, in the unit that agrees with the
    log's times, or None."""
    for field in OWN_TIMES:
        result = {}
        for key, messages in channels.items():
            if len(messages) < 2 or any(field not in fields for _, fields in messages):
                break
            log = messages[-1][0] - messages[0][0]
            own = messages[-1][1][field] - messages[0][1][field]
            unit = next((u for u in UNITS_OF_TIME if log > 0 and abs(own * u - log) <= AGREE * log), None)
            if unit is None:
                break
            result[key] = [fields[field] * unit for _, fields in messages]
        else:
            return field, result
    return None, None


def _join(path, channels):
    """Makes a run of the messages of all channels: messages that are close together share a row."""
    field, own = _own_times(channels)
    times = own or {key: [time for time, _ in messages] for key, messages in channels.items()}
    if field:
        say(f"{path}: times are those of the field {field}")
    several = len({channel for channel, _ in channels}) < len(channels)  # two types on one channel
    names, stream = {}, []
    for key, messages in channels.items():
        prefix = f"{key[0]}.{key[1].rsplit('.', 1)[-1]}." if several else f"{key[0]}."
        for time, (_, fields) in zip(times[key], messages):
            stream.append((time, key, {prefix + name: value for name, value in fields.items() if name != field}))
            for name in stream[-1][2]:
                names.setdefault(name, len(names))
    if len(names) > MOST_COLUMNS:
        raise Refused(DATA, f"{path}: {len(names)} fields, expected at most {MOST_COLUMNS}")
    stream.sort(key=lambda event: event[0])
    periods = [numpy.median(numpy.diff(of)) for of in times.values() if len(of) > 1]
    close = TOGETHER * min(periods, default=0) if len(channels) > 1 else 0
    rows, keys, moments = [], set(), []
    for time, key, values in stream:
        if not rows or key in keys or time - moments[-1] > close:
            rows.append({})
            keys = set()
            moments.append(time)
        rows[-1].update(values)
        keys.add(key)
    if len(channels) > 1:
        say(f"{path}: {len(channels)} channel{'' if len(channels) == 1 else 's'}; messages within {close:.3g} s of each other are one sample")
    value = numpy.full((len(rows), 1 + len(names)), numpy.nan)
    for k, (time, row) in enumerate(zip(moments, rows)):
        value[k, 0] = time - moments[0]
        for name, number in row.items():
            value[k, 1 + names[name]] = number
    return [Run(path, ["t", *names], value, ["s"] + [""] * len(names))]
