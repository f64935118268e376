#!/usr/bin/env python3
"""test_structure.py: how daemon/ and trainer/ are divided into functions and files. Runs in the repository's root.

Counts what makes a program long to read, and fails if a count is above its limit below:
- static functions that are named once outside their definition: mostly parts of their only caller;
- public functions that a single file of the same folder uses: the two files are one;
- public functions that no program uses: dead, or there for tests alone;
- places that ask for a kind of subsystem or method by a flag, outside the files that define the kinds;
- numbers without a name in trainer/propose.

    tests/unit/test_structure.py              the test
    tests/unit/test_structure.py FOLDER       lists what is counted below FOLDER
"""
import collections
import pathlib
import re
import sys

# The limits. Whoever gets lower lowers them.
STATICS_ONCE = 0.25  # of all functions
FOR_ONE_SIBLING = 247  # public functions
UNUSED = 4  # public functions
UNNAMED_NUMBERS = 0  # in trainer/propose

# A kind that is asked for by a flag: what the question looks like, the files that define the kind, how many
# questions there may be elsewhere.
KINDS = {
    "solid": (r"\bsolid [!=]= NULL", r"daemon/model/(part|solid/)|daemon/scene/model_reader|trainer/bodies/", 0),
    "gap": (r"\bgap [!=]= NULL", r"daemon/model/", 0),
    "discrete gradient": (r"(->|\.)discrete\b", r"daemon/scene/integrator|daemon/model/feature", 0),
    "adaptive step": (r"\btolerance > 0", r"daemon/scene/scene.h", 0),
}

# A text without its comments, strings and characters.
UNREAD = re.compile(r"""//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'""", re.DOTALL)
DIRECTIVE = re.compile(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE)
NAME = re.compile(r"[A-Za-z_]\w*")
NUMBER = re.compile(r"(?<![\w.])(?:0x[0-9a-f]+|\d+\.?\d*(?:e[-+]?\d+)?)", re.IGNORECASE)
PLAIN = {0, 0.5, 1, 2, 3, 4}  # numbers that need no name

Function = collections.namedtuple("Function", "file name static body")


def definitions(file, code):
    """The functions that a file defines: what stands before a brace at the outermost level and has arguments."""
    code = DIRECTIVE.sub("", code)
    depth = start = opened = 0
    for at in re.finditer(r"[{};]", code):
        if at[0] == "{":
            if depth == 0:
                head, opened = code[start : at.start()], at.start()
            depth += 1
        elif at[0] == "}":
            depth -= 1
            if depth == 0:
                name = re.match(r"[^(=]*?([A-Za-z_]\w*)\s*\(", head)
                if name and "=" not in head and not re.match(r"\s*typedef\b", head):
                    yield Function(file, name[1], "static" in NAME.findall(head), code[opened : at.end()])
                start = at.end()
        elif depth == 0:
            start = at.end()


def unnamed_numbers(function):
    """The numbers in a function that no constant names: all but small ones and those that a constant is defined as."""
    body = re.sub(r"\bconst [^;=]*=\s*-?[\d.e-]+;|\benum \{[^}]*\}", "", function.body)
    return [number for number in NUMBER.findall(body) if float(int(number, 16) if "x" in number else number) not in PLAIN]


class Source:
    def __init__(self):
        self.code = {}
        for top in "daemon", "trainer":
            for path in sorted(pathlib.Path(top).rglob("*.[ch]")):
                self.code[path.as_posix()] = UNREAD.sub(" ", path.read_text())
        self.names = {file: collections.Counter(NAME.findall(code)) for file, code in self.code.items()}
        self.functions = [f for file, code in self.code.items() for f in definitions(file, code)]
        self.lines = sum(path.read_text().count("\n") for path in map(pathlib.Path, self.code))

    def statics_once(self):
        for f in self.functions:
            if f.static and f.file.endswith(".c"):
                declared = len(re.findall(r"^static [^;{}=]*\b%s\([^;{}]*\);" % f.name, self.code[f.file], re.MULTILINE))
                if self.names[f.file][f.name] - 1 - declared == 1:
                    yield f"{f.file}: {f.name} is used once"

    def for_one_sibling(self):
        for f in self.functions:
            if f.static or not any(f.name in names for file, names in self.names.items() if file.endswith(".h")):
                continue
            users = [file for file, names in self.names.items() if file.endswith(".c") and file != f.file and f.name in names]
            if len(users) == 1 and pathlib.Path(users[0]).parent == pathlib.Path(f.file).parent:
                yield f"{f.file}: {f.name} serves {users[0]} alone"

    def unused(self):
        for f in self.functions:
            interface = re.match(r"daemon/library/portmet\.|daemon/export/fmi/|.*\.h$", f.file) or not f.name.startswith("pm_")
            own = self.names[f.file][f.name] > 1
            if not f.static and not interface and not own and not self.users(f):
                yield f"{f.file}: nobody uses {f.name}"

    def users(self, f):
        """The other files that name a function; its header only counts if its own macros or functions use it."""
        header = re.sub(r"\.c$", ".h", f.file)
        return [
            file
            for file, names in self.names.items()
            if file != f.file and names[f.name] > (file == header) and (file.endswith(".c") or file == header)
        ]

    def kinds(self, kind):
        question, home, _ = KINDS[kind]
        for file, code in self.code.items():
            for line in code.split("\n") if not re.match(home, file) else []:
                if re.search(question, line):
                    yield f"{file}: asks for a {kind}: {line.strip()}"

    def unnamed(self):
        for f in self.functions:
            if f.file.startswith("trainer/propose/"):
                for number in unnamed_numbers(f):
                    yield f"{f.file}: {f.name} has the number {number}"


def main():
    source = Source()
    nfunction = len(source.functions)
    if nfunction < 1000:
        sys.exit(f"FAILED: found only {nfunction} functions")
    counts = [  # what, the list of it, how many there may be
        ("static functions used once", list(source.statics_once()), int(STATICS_ONCE * nfunction)),
        ("public functions for one sibling", list(source.for_one_sibling()), FOR_ONE_SIBLING),
        ("public functions that no program uses", list(source.unused()), UNUSED),
        ("numbers without a name in trainer/propose", list(source.unnamed()), UNNAMED_NUMBERS),
    ]
    counts += [(f"questions for the kind: {kind}", list(source.kinds(kind)), KINDS[kind][2]) for kind in KINDS]
    if len(sys.argv) > 1:
        for _, found, _ in counts:
            print(*(line for line in found if line.startswith(sys.argv[1])), sep="\n")
    failures = 0
    print(f"{source.lines} lines, {nfunction} functions")
    for what, found, most in counts:
        share = f" ({100 * len(found) / nfunction:.1f} % of all functions)" if "used once" in what else ""
        print(f"{'FAILED: ' if len(found) > most else ''}{what}: {len(found)}{share}, at most {most}")
        failures += len(found) > most
    sys.exit(failures > 0)


if __name__ == "__main__":
    main()
