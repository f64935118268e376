#!/usr/bin/env python3
"""test_clang.py BUILD: clang reads every source that BUILD would compile, its benches included, without a warning.

It only reads, which takes 10 s of CPU; tests/run.sh also builds and tests with clang.
"""
import concurrent.futures
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys


def read(entry):
    arguments = shlex.split(entry["command"])
    if "ccache" in arguments[0]:
        del arguments[0]
    at = arguments.index("-o")
    del arguments[at : at + 2]
    command = ["clang", *arguments[1:], "-fsyntax-only", "-Werror"]
    result = subprocess.run(command, cwd=entry["directory"], capture_output=True, text=True)
    return result.stderr if result.returncode else ""


def main():
    if shutil.which("clang") is None:
        print("skipped: there is no clang (apt-get install clang)")
        sys.exit(77)
    entries = json.loads((pathlib.Path(sys.argv[1]) / "compile_commands.json").read_text())
    own = [entry for entry in entries if "/lcmtypes/" not in entry["file"]]
    if len(own) < 300:
        sys.exit(f"FAILED: expected some hundred sources, found {len(own)}")
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        found = [text for text in pool.map(read, own) if text]
    print(*found, f"{len(own)} sources, {len(found)} with warnings", sep="\n")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
