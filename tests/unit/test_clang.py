#!/usr/bin/env python3
"""test_clang.py BUILD: clang reads every source that BUILD would compile, its benches included, without a warning.

It only reads. Where PM_READ_BY_CLANG names another build, by clang and with warnings as errors, what is compiled there is
left out, but for sources that differ under sanitizers.
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


def is_compiled(entry, build):
    """Returns whether the object of a source is in a build, and newer than the source, which does not ask for sanitizers."""
    arguments = shlex.split(entry["command"])
    source, compiled = pathlib.Path(entry["file"]), build / arguments[arguments.index("-o") + 1]
    return (compiled.exists() and compiled.stat().st_mtime > source.stat().st_mtime
            and "PM_SANITIZE" not in source.read_text())


def main():
    if shutil.which("clang") is None:
        print("skipped: there is no clang (apt-get install clang)")
        sys.exit(77)
    entries = json.loads((pathlib.Path(sys.argv[1]) / "compile_commands.json").read_text())
    own = [entry for entry in entries if "/lcmtypes/" not in entry["file"]]
    if len(own) < 300:
        sys.exit(f"FAILED: expected some hundred sources, found {len(own)}")
    if "PM_READ_BY_CLANG" in os.environ:
        own = [entry for entry in own if not is_compiled(entry, pathlib.Path(os.environ["PM_READ_BY_CLANG"]))]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        found = [text for text in pool.map(read, own) if text]
    print(*found, f"{len(own)} sources, {len(found)} with warnings", sep="\n")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
