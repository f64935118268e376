#!/usr/bin/env python3
"""test_headline.py: the README's table of results is the one that tests/bench/headline/headline.py makes of its results."""
import pathlib
import subprocess
import sys

script = pathlib.Path("tests/bench/headline/headline.py")
table = subprocess.run([sys.executable, script, "--table"], capture_output=True, text=True, check=True).stdout
if table.count("\n") < 4:
    sys.exit("FAILED: the table has no rows")
if table not in pathlib.Path("README.md").read_text():
    sys.exit(f"FAILED: README.md has another table than {script} --table prints:\n{table}")
