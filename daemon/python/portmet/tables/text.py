# SPDX-License-Identifier: MIT
"""Tables in text files, as loggers, spreadsheets and programs write them.

The reader looks at the numbers first: it takes the separator and the decimal sign by which most places of the lines in
the middle of the file are numbers, and learns from these lines how many columns there are and what they hold. The
header is the last block of lines of words before the first line of such numbers; what stands above is a preamble."""
import collections
import csv
import gzip
import re

import numpy

import stamps
from table import BRACKETS, DATA, FILE, Refused, Run, is_time_name, say

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?")
MISSING = ("nan", "-nan", "+nan", "na", "n/a", "#n/a", "n.a.", "null", "none", "nil", "-", "--", "---", "?", "*", "1.#qnan",
           "-1.#ind", "1.#ind", "nan(ind)", "-nan(ind)", "missing")
IS_MISSING, TOKENS = frozenset(), ""
SEPARATORS = (",", ";", "\t", "|", None)  # None: blanks
LOOKED_AT = 400  # lines at the beginning, and spread over the rest, by which the reader decides
COMMENTS = ("#", "%", "//", "!")
NUMBERS, STAMPS, DATES, CLOCKS, WORDS, EMPTY = "numbers", "stamps", "dates", "clocks", "words", "empty"


def set_missing(more):
    """Sets the words that stand for missing samples: the usual ones and `more`."""
    global IS_MISSING, TOKENS
    words = {*MISSING, *(word.lower() for word in more)}
    IS_MISSING = frozenset(("", *words))
    TOKENS = "|".join(re.escape(word) for word in sorted(words, key=len, reverse=True))


set_missing(())


def kind_of(text):
    """Returns what a place of a line holds; decimal commas are already points."""
    if NUMBER.fullmatch(text):
        return NUMBERS
    if text.lower() in IS_MISSING:
        return EMPTY
    if not text[0].isdigit():
        return WORDS
    return DATES if stamps.is_date(text) else STAMPS if stamps.is_stamp(text) else CLOCKS if stamps.is_clock(text) else WORDS


def split(line, separator, decimal):
    """Divides a line into its places, without blanks and quotation marks around them."""
    if separator is None:
        places = line.split()
    elif '"' in line:
        places = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    else:
        places = line.split(separator)
    places = [place.strip().strip('"').strip() for place in places]
    if decimal == ",":
        places = [place.replace(",", ".") if re.fullmatch(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?", place) else place for place in places]
    return places


def read_lines(path):
    """Returns the lines of a file, and whether the last one is complete."""
    try:
        with open(path, "rb") as file:
            data = file.read()
        if data[:2] == b"\x1f\x8b":
            data = gzip.decompress(data)
    except (OSError, EOFError, gzip.zlib.error) as error:
        raise Refused(FILE, f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = data.decode("utf-16", "replace")
    elif b"\0" in data:
        raise Refused(DATA, f"{path}: this is no table: neither a text nor a file of a known kind")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    if not text.strip():
        raise Refused(DATA, f"{path}: the file is empty")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return text.split("\n"), text.endswith("\n")


class Shape:
    """How the lines of a file are divided: separator, decimal sign, number of places, and what each column holds."""

    def __init__(self, path, sample):
        best = (0, 0)
        for separator in SEPARATORS:
            for decimal in ".,":
                if decimal == separator and not any('"' in line for line in sample):
                    continue
                rows = [split(line, separator, decimal) for line in sample]
                kinds = [[kind_of(place) for place in row] for row in rows]
                # Lines of words are headers or preambles.
                count = collections.Counter(len(row) for row in kinds if set(row) - {WORDS, EMPTY})
                if not count:
                    continue
                width, lines = count.most_common(1)[0]
                alike = [kind for kind in kinds if len(kind) == width and set(kind) - {WORDS, EMPTY}]
                valued = sum(kind != WORDS for row in alike for kind in row) / (width * len(alike))
                # One column whose numbers hold commas may well be two.
                score = (round((0.5 if width == 1 else 1) * valued * lines / len(sample), 3), width)
                if score > best:
                    best, self.separator, self.decimal, self.width = score, separator, decimal, width
                    self.kinds = [self._vote([row[i] for row in alike]) for i in range(width)]
        if best[0] == 0:
            raise Refused(DATA, f"{path}: there is no line of numbers")
        self.empty_end = 0  # places at the end of all lines that hold nothing, which a header may lack
        while self.kinds[-1 - self.empty_end] == EMPTY:
            self.empty_end += 1

    @staticmethod
    def _vote(kinds):
        count = collections.Counter(kind for kind in kinds if kind != EMPTY)
        if not count:
            return EMPTY
        if 2 * count[NUMBERS] >= sum(count.values()):
            return NUMBERS
        return count.most_common(1)[0][0]

    def split(self, line):
        return split(line, self.separator, self.decimal)

    def count(self, line):
        if self.separator is None or '"' in line:
            return len(self.split(line))
        return line.count(self.separator) + 1

    def fits(self, places):
        """Tells whether a line is one of the table."""
        if len(places) != self.width:
            return False
        kinds = [kind_of(place) for place in places]
        return any(kind not in (WORDS, EMPTY) for kind in kinds) and all(
            own in (EMPTY, wanted) or wanted in (WORDS, EMPTY) for own, wanted in zip(kinds, self.kinds))


def is_words(places):
    kinds = {kind_of(place) for place in places}
    return WORDS in kinds and kinds <= {WORDS, EMPTY}


def find_header(path, shape, lines):
    """Returns the names, their units, and the position of the first line of the table. `lines` are pairs of a number
    and a text, without blank lines and comments."""
    block, candidate, begin = [], [], 0
    for i, (_, line) in enumerate(lines):
        places = shape.split(line)
        if shape.fits(places):
            begin = begin if candidate else i
            break
        if shape.separator is None and len(places) != shape.width:  # names of several words, two blanks or more apart
            apart = re.split(r"\s{2,}|\t", line.strip())
            places = apart if len(apart) == shape.width else places
        near = -1 - shape.empty_end <= len(places) - shape.width <= 1 and is_words(places)
        block = block + [places] if near else []
        if near:
            candidate, begin = block, i + 1
    else:
        raise Refused(DATA, f"{path}: there is no line of {shape.width} numbers as in the rest of the file")
    above = begin - len(candidate)
    if above > 0:
        say(f"{path}: leaves out {above} line{'s' if above > 1 else ''} above the table, from line {lines[0][0]} on")
    if not candidate:
        return None, None, begin
    times = [i for i, row in enumerate(candidate) if any(is_time_name(name_and_unit(place)[0]) for place in row)]
    distinct = [i for i, row in enumerate(candidate) if len({place for place in row if place}) == sum(map(bool, row))]
    at = (times or distinct[:1] or [0])[-1]
    fields = [name_and_unit(place) for place in candidate[at]]
    names, units = [name for name, _ in fields], [unit for _, unit in fields]
    if len(names) == shape.width - 1 and shape.kinds[-1] != EMPTY:  # R does not name the column of row names
        names, units = [""] + names, [""] + units
    if len(names) > shape.width and names[-1]:
        say(f'{path}: leaves out the name "{names[-1]}", below which there is nothing')
    names = (names + [""] * shape.width)[:shape.width]
    units = (units + [""] * shape.width)[:shape.width]
    if at + 1 < len(candidate):  # a line of units
        for i, unit in enumerate(candidate[at + 1][:shape.width]):
            units[i] = units[i] or unit.strip("[]()").strip()
    return names, units, begin


def name_and_unit(text):
    """Divides "theta [rad]" or "T / K"; blanks inside a name become '_'."""
    found = BRACKETS.fullmatch(text)
    name, unit = (found[1], found[2]) if found else text.rsplit(" / ", 1) if " / " in text else (text, "")
    return re.sub(r"\s+", "_", name.strip()), unit.strip()


def names_of_comment(path, shape, lines, first):
    """Returns names and units that a comment before the first line of numbers gives, as numpy.savetxt writes them."""
    before = [line for number, line in lines if number < first and line.lstrip().startswith(COMMENTS)]
    if before:
        places = shape.split(before[-1].lstrip("#%/! \t"))
        if len(places) == shape.width and all(kind_of(place) == WORDS for place in places):
            fields = [name_and_unit(place) for place in places]
            return [name for name, _ in fields], [unit for _, unit in fields]
    return [f"column_{i + 1}" for i in range(shape.width)], [""] * shape.width


def read(path):
    """Reads a text file as a Run."""
    lines, complete = read_lines(path)
    lines = [(k + 1, line) for k, line in enumerate(lines) if line.strip()]
    content = [(k, line) for k, line in lines if not line.lstrip().startswith(COMMENTS)]
    if not content:
        raise Refused(DATA, f"{path}: there is no line of numbers")
    step = max(1, len(content) // LOOKED_AT)
    sample = content[:LOOKED_AT] if len(content) < 2 * LOOKED_AT else content[LOOKED_AT // 2::step]
    shape = Shape(path, [line for _, line in sample])
    names, units, begin = find_header(path, shape, content[:2000])
    body = content[begin:]
    if names is None:
        names, units = names_of_comment(path, shape, lines, body[0][0])
    body = drop_end(path, shape, body, complete or lines[-1] != body[-1])
    values = numbers(path, shape, names, body)
    line = [k for k, _ in body]
    run = Run(path, names, values, units, line)
    read_times(path, shape, run, body)
    left_out = [i for i, kind in enumerate(shape.kinds) if kind == WORDS]
    for i in left_out:
        example = next((text for _, row in body for text in [shape.split(row)[i]] if kind_of(text) == WORDS), "")
        say(f'{path}: leaves out column "{names[i]}", which holds no number but "{example[:40]}"')
    empty = [i for i, kind in enumerate(shape.kinds) if kind == EMPTY and run.names[i]]
    if empty and len(empty) < shape.width:
        say(f'{path}: leaves out what holds nothing: {" ".join(run.names[i] for i in empty)}')
    run.keep_columns([i for i, kind in enumerate(shape.kinds) if kind in (NUMBERS, STAMPS)])
    return run


def drop_end(path, shape, body, complete):
    """Leaves out a last line that was cut, and a foot of words below the table. Refuses other lines that have another
    number of places than the table."""
    counts = [shape.count(line) for _, line in body]
    end = len(body)
    while end > 0 and counts[end - 1] != shape.width and is_words(shape.split(body[end - 1][1])):
        end -= 1
    if end < len(body):
        say(f"{path}: leaves out the last {len(body) - end} lines, from line {body[end][0]} on, which are words")
    elif not complete and counts[-1] < shape.width and len(body) > 1:
        end -= 1
        say(f"{path}: leaves out the last line, {body[-1][0]}, which is cut")
    for (number, _), count in zip(body[:end], counts):
        if count != shape.width:
            raise Refused(DATA, f"{path}:{number}: expected {shape.width} columns as in the other lines, found {count}")
    return body[:end]


def numbers(path, shape, names, body):
    """Returns the numbers of all columns [row][column]; NaN where a column holds none."""
    values = numpy.full((len(body), shape.width), numpy.nan)
    wanted = [i for i, kind in enumerate(shape.kinds) if kind == NUMBERS]
    if not wanted:
        return values
    text = "\n".join(line for _, line in body)
    quick = shape.decimal != shape.separator
    if '"' in text:
        text = text.replace('"', "")
        quick = quick and all(shape.separator is None or line.count(shape.separator) + 1 == shape.width
                              for line in text.split("\n"))
    if shape.decimal == ",":
        text = text.replace(",", ".")
    blank = "[ ]*" if shape.separator == "\t" else "[ \t]*"
    missing = (rf"(?<=[ \t\n])(?:{TOKENS})(?=[ \t\n])" if shape.separator is None else
               rf"(?<=[{shape.separator}\n]){blank}(?:{TOKENS})?{blank}(?=[{shape.separator}\n])")
    for pattern in (None, missing) if quick else ():
        if pattern:
            text = re.sub(pattern, "nan", "\n" + text + "\n", flags=re.IGNORECASE)[1:-1]
        try:
            found = numpy.loadtxt(text.split("\n"), delimiter=shape.separator, usecols=wanted, comments=None, ndmin=2)
        except (ValueError, UnicodeError):
            continue
        if found.shape[0] == len(body) and not numpy.isinf(found).any():
            values[:, wanted] = found
            return values
    # Place by place, which finds the one that is wrong.
    for k, (number, line) in enumerate(body):
        places = shape.split(line)
        for i in wanted:
            kind = kind_of(places[i])
            if kind == NUMBERS:
                values[k, i] = float(re.sub("[dD]", "e", places[i]))
            if kind not in (NUMBERS, EMPTY) or numpy.isinf(values[k, i]):
                raise Refused(DATA, f'{path}:{number}: expected a number, found "{places[i][:40]}" in column "{names[i]}"')
    return values


def read_times(path, shape, run, body):
    """Turns the columns of stamps, dates and times of the day into s since the first one. A column of dates and one of
    times of the day become one."""
    dates = [i for i, kind in enumerate(shape.kinds) if kind == DATES]
    clocks = [i for i, kind in enumerate(shape.kinds) if kind == CLOCKS]
    together = dates[0] if dates and clocks else None
    for i, kind in enumerate(shape.kinds):
        if kind not in (STAMPS, DATES, CLOCKS):
            continue
        texts = [shape.split(line)[i] for _, line in body]
        if i == together:
            clock = [shape.split(line)[clocks[0]] for _, line in body]
            texts = [f"{date} {time}" if date and time else "" for date, time in zip(texts, clock)]
        elif together is not None and i == clocks[0]:
            shape.kinds[i] = EMPTY
            run.names[i] = ""
            continue
        try:
            read_ns = stamps.read_clocks(texts) if kind == CLOCKS else stamps.read_stamps(texts)
        except ValueError as error:
            raise Refused(DATA, f'{path}: column "{run.names[i]}": {error}') from None
        for k, (text, ns) in enumerate(zip(texts, read_ns)):
            if ns is None and kind_of(text) != EMPTY:
                raise Refused(DATA, f'{path}:{body[k][0]}: expected a time, found "{text[:40]}" in column "{run.names[i]}"')
        first = next((ns for ns in read_ns if ns is not None), 0)
        run.value[:, i] = [numpy.nan if ns is None else (ns - first) * 1e-9 for ns in read_ns]
        if not run.names[i]:
            run.names[i] = f"column_{i + 1}" if any(map(is_time_name, run.names)) else "time"
        run.stamps.add(run.names[i])
        run.units[i] = ""
        shape.kinds[i] = STAMPS
