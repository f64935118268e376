#!/usr/bin/env python3
"""test_tables.py BUILD: `portmet-train import` reads tables as programs write them, number by number; and what is cut or
damaged ends with one line and the exit code of a file or its content, never with a traceback."""
import contextlib
import gzip
import io
import math
import os
import pathlib
import random
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time

try:
    import h5py
    import numpy as np
    import scipy.io
except ImportError:
    if sys.executable != "/usr/bin/python3" and os.path.exists("/usr/bin/python3"):
        os.execv("/usr/bin/python3", ["/usr/bin/python3", *sys.argv])
    print("skipped: no Python 3 with h5py and scipy (Debian: python3-h5py python3-scipy)")
    sys.exit(77)

build = pathlib.Path(sys.argv[1]).resolve()
train, daemon = build / "trainer/portmet-train", build / "daemon/app/portmetd"
folder = pathlib.Path(tempfile.mkdtemp())
sys.path.insert(0, str(build / "daemon/python/portmet/tables"))
import reader  # noqa: E402

nan = float("nan")
failures = []
LOG, LCM_PORT = "log", 7667


def check(holds, text):
    if not holds:
        failures.append(text)
        print("FAILED:", text)


def run(*words, **options):
    return subprocess.run(list(map(str, words)), capture_output=True, text=True, timeout=200, check=False, **options)


def import_tables(words, out, program):
    """Imports by the program, or in this process, which saves the start of a Python."""
    if program:
        return run(train, "import", *words, "-o", out)
    arguments, tables = [str(out)], []
    words = list(map(str, words))
    while words:
        word = words.pop(0)
        if word == "--log":
            tables.append(words.pop(0))
        elif word.startswith("--"):
            arguments.append(f"{word}={words.pop(0)}")
        else:
            tables.append(word)
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as error:
        code = reader.main([*arguments, "--", *tables])
    return subprocess.CompletedProcess(words, code, said.getvalue(), error.getvalue())


def imported(what, *words, program=False):
    """Imports tables; returns z, t, the names and the units, and what was printed."""
    out = folder / "out.h5"
    done = import_tables(words, out, program)
    check(done.returncode == 0 and not done.stderr, f"{what}: exit code {done.returncode}, {done.stderr}")
    if done.returncode != 0:
        return np.zeros((1, 1, 1)), np.zeros(1), [], [], done.stdout
    with h5py.File(out) as file:
        return (file["z"][()], file["t"][()], file.attrs["state_layout"].decode().split(),
                file.attrs["units"].decode().split(";"), done.stdout)


def same(what, found, expected):
    found, expected = np.asarray(found), np.asarray(expected, dtype=float)
    check(found.shape == expected.shape and np.array_equal(found, expected, equal_nan=True),
          f"{what}: found\n{found}\nexpected\n{expected}")


def write(name, text, encoding="utf-8"):
    (folder / name).write_bytes(text.encode(encoding) if isinstance(text, str) else text)
    return folder / name


def refused(what, code, words, *arguments, program=False):
    done = import_tables(arguments, folder / "no.h5", program)
    check(done.returncode == code and words in done.stderr and done.stderr.count("\n") == 1 and
          done.stderr.startswith("portmet-train: "), f"{what}: exit code {done.returncode}, {done.stderr!r}, expected {words!r}")
    check(not (folder / "no.h5").exists(), f"{what}: a refused table left a file")


def tables():
    """Seven tables, as seven programs write them."""
    german = write("german.csv", "Messger\u00e4t;Logger 7\nSeriennummer;4711\n\nZeit Stempel;Temp.;Druck;Status\n"
                   "-;\u00b0C;bar;\n2024-03-01 23:59:58;21,5;1,01;ok\n2024-03-01 23:59:59;21,75;N/A;ok\n"
                   "2024-03-02 00:00:00;;-0,5e1;ok\nEnde der Aufzeichnung\n", "latin-1")
    z, t, names, units, said = imported("german", german, program=True)
    same("german", z, [[[21.5, 1.01], [21.75, nan], [nan, -5]]])
    same("german, times", t, [0, 1, 2])
    check(names == ["Temp.", "Druck"] and units == ["\u00b0C", "bar"], f"german: {names} {units}")
    check('leaves out column "Status"' in said and "above the table" in said and "last 1 lines" in said, f"german: {said}")

    pandas = write("pandas.csv", ",time,x,v\n0,2024-03-01T10:00:00.250+01:00,1.5,-2e-3\n1,2024-03-01T09:00:00.500Z,,4\n"
                   "2,2024-03-01T10:00:01+01:00,2.5,nan\n")
    z, t, names, _, _ = imported("pandas", pandas)
    same("pandas", z, [[[1.5, -2e-3], [nan, 4], [2.5, nan]]])
    same("pandas, times", t, [[0, 0.25, 0.75]])
    check(names == ["x", "v"], f"pandas: {names}")

    spaces = write("spaces.csv", "# made by hand\n  t (ms) , \"heat flow\" [kW] , T1 (degC),\n 0, 1 , 20.5,\n 100 ,2, 21,\n"
                   "\n# a pause\n 200, 3,-,\n")
    z, t, names, units, _ = imported("spaces", spaces)
    same("spaces", z, [[[1, 20.5], [2, 21], [3, nan]]])
    same("spaces, times", t, [0, 0.1, 0.2])
    check(names == ["heat_flow", "T1"] and units == ["kW", "degC"], f"spaces: {names} {units}")

    campbell = write("campbell.dat", '"TOA5","station","CR1000","1234"\r\n"TIMESTAMP","RECORD","AirTC","WS_ms"\r\n'
                     '"TS","RN","Deg C","m/s"\r\n"","","Avg","Smp"\r\n"2024-06-01 00:00:00",0,15.25,"NAN"\r\n'
                     '"2024-06-01 00:10:00",1,15.5,2.75\r\n"2024-06-01 00:20:00",2,15,3\r\n')
    z, t, names, units, _ = imported("campbell", campbell)
    same("campbell", z, [[[0, 15.25, nan], [1, 15.5, 2.75], [2, 15, 3]]])
    same("campbell, times", t, [0, 600, 1200])
    check(units == ["RN", "Deg C", "m/s"], f"campbell: {units}")

    logger = write("logger.txt", "Time_ms\tlevel\tflow\n0\t0.5\t-999\n0\t0.6\t1\n20\t-999\t2\n40\t0.75\t3\n45\t0.75\t3\n\n")
    z, t, names, _, said = imported("logger", logger, "--missing", "-999,9999", program=True)
    same("logger", z, [[[0.5, nan], [nan, 2], [0.75, 3], [0.75, 3]]])
    same("logger, times", t, [[0, 0.02, 0.04, 0.045]])
    check("1 rows that repeat a time" in said and "2 samples that --missing names" in said, f"logger: {said}")

    turns = write("turns.csv", "t [s],phi [deg],q [rad],x [m]\n0,170,3,170\n1,-175,-3,-175\n2,,3,10\n3,178,-3,178\n4,-178,,-178\n")
    z, _, _, _, said = imported("turns", turns, program=True)
    same("turns", z, [[[170, 3, 170], [185, 2 * math.pi - 3, -175], [nan, 3, 10], [178, 2 * math.pi - 3, 178],
                       [182, nan, -178]]])
    check(said.count("its turns are joined") == 2, f"turns: {said}")
    swings = write("swings.csv", "t [s],phi [deg]\n0,100\n1,-70\n2,90\n")
    z, _, _, _, said = imported("swings", swings, program=True)
    same("swings", z, [[[100], [-70], [90]]])

    plain = write("plain.txt", "# t x y\n 0.00e+00  1.0e+00 -1\n 5.00e-01  2.0e+00 nan\n 1.00e+00  3.0e+00  1\n")
    z, t, names, _, _ = imported("plain", plain)
    same("plain", z, [[[1, -1], [2, nan], [3, 1]]])
    same("plain, times", t, [0, 0.5, 1])
    check(names == ["x", "y"], f"plain: {names}")

    clock = write("clock.csv", "Date,Time,rpm\n31.12.2023,23:59:59.5,100\n01.01.2024,00:00:00.0,101\n01.01.2024,00:00:00.5,102\n")
    z, t, names, _, _ = imported("clock", clock)
    same("clock", z, [[[100], [101], [102]]])
    same("clock, times", t, [0, 0.5, 1])

    z, t, _, _, _ = imported("a time with its unit", write("px4.csv", "stamp,x\n1000000,1\n1004000,2\n"), "--time", "stamp [us]")
    same("a time with its unit", t, [1, 1.004])
    z, _, names, _, said = imported("a cut line", write("cut.csv", "t,x\n0,1,\n1,2,\n2"))
    same("a cut line", z, [[[1], [2]]])
    check("leaves out the last line, 4, which is cut" in said, f"a cut line: {said}")
    labview = write("labview.txt", "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\t\nChannels\t2\t\n"
                    "Y_Unit_Label\tVolts\tVolts\nX_Value\tU0\tU1\tComment\n0,0\t1,5\t2,5\n0,001\t1,6\t2,6\n")
    z, t, names, _, _ = imported("labview", labview)
    same("labview", z, [[[1.5, 2.5], [1.6, 2.6]]])
    check(names == ["U0", "U1"], f"labview: {names}")

    # A "T" is no time where another column has one, whatever the stamps look like; hours may pass 24.
    for what, texts, step in (
            ("ISO", ("2024-01-31T23:59:59.500+01:00", "2024-01-31T23:00:00Z"), 0.5),
            ("two digits", ("31.12.23 23:59:59", "01.01.24 00:00:00"), 1),
            ("a month's name", ("31-Dec-2023 23:59:59", "01-Jan-2024 00:00:00"), 1),
            ("hours", ("24:59:59.0", "125:00:00.0"), 100 * 3600 + 1),
            ("numbers", ("0.5", "0.75"), 0.25)):
        rows = "".join(f"{text},{20 + k}\n" for k, text in enumerate(texts))
        z, t, names, units, _ = imported(what, write("stamps.csv", "elapsed,T [degC]\n" + rows))
        same(what, z, [[[20], [21]]])
        check(names == ["T"] and units == ["degC"] and abs(np.diff(t.ravel())[0] - step) < 1e-9, f"{what}: {names} {units} {t}")
    ends = write("ends.csv", "t,x,y\n0,1,OVL,,,\n1,2,5,,,\n2,bad,6,,,\n")
    z, _, names, _, _ = imported("commas at the end, words for what is missing", ends, "--missing", "ovl,-9,Bad", program=True)
    same("commas at the end", z, [[[1, nan], [2, 5], [nan, 6]]])
    refused("a word in a column of numbers", 5, 'found "OVL"', ends)
    apart = write("apart.txt", "Time (s)  Motor speed (rpm)  i (A)\n0  1  2\n1  3  4\n")
    _, _, names, units, _ = imported("names of several words", apart)
    check(names == ["Motor_speed", "i"] and units == ["rpm", "A"], f"names of several words: {names} {units}")

    # --- several of them, of different lengths; one file with several runs; no times; a folder ---
    (folder / "runs").mkdir()
    for k, (first, rows) in enumerate(((0, 4), (100, 3))):
        write(f"runs/{k}.csv", "t,a,b\n" + "".join(f"{first + 0.1 * i:.1f},{i},{k}\n" for i in range(rows)))
    z, t, _, _, said = imported("runs", folder / "runs", program=True)
    check("even" in run(train, "inspect", folder / "runs").stdout, "even times of runs of different lengths")
    same("runs", z, [[[0, 0], [1, 0], [2, 0], [3, 0]], [[0, 1], [1, 1], [2, 1], [nan, nan]]])
    check(t.shape == (2, 4) and np.allclose(t[:, :3], [0, 0.1, 0.2], atol=1e-9) and np.isnan(t[1, 3]), f"runs: times {t}")
    check("begins at the time 0" in said, f"runs: {said}")
    swapped = write("swapped.csv", "b,t,a\n7,0,1\n8,0.1,2\n")
    z, *_ = imported("swapped", folder / "runs/0.csv", swapped)
    same("swapped", z[1, :2], [[1, 7], [2, 8]])
    numbered = write("numbered.csv", "run,x\n1,10\n1,11\n2,20\n2,21\n2,22\n")
    z, t, _, _, _ = imported("numbered", numbered, "--runs", "run", "--dt", "0.5")
    same("numbered", z[:, :, 0], [[10, 11, nan], [20, 21, 22]])
    rounded = write("rounded.csv", "t,x\n" + "".join(f"{k / 60:.4f},{k}\n" for k in range(600)))
    _, t, _, _, _ = imported("rounded", rounded)
    check(t.ndim == 1, "times of 60 Hz that are rounded to 0.1 ms are even")

    # --- mistakes ---
    for text, words in (("t,a\n0,1\n1,x\n", 'bad.csv:3: expected a number, found "x" in column "a"'),
                        ("t,a\n0,1\n1,2,3\n", "bad.csv:3: expected 2 columns"), ("", "the file is empty"),
                        ("t,a\n0,1\n2,1\n1,1\n", "bad.csv:4: the time 1 s follows 2 s"), ("t,a,a\n0,1,1\n1,1,1\n", "two columns"),
                        ("t [m],a\n0,1\n1,2\n", "no unit of time"), ("words\nand words\n", "there is no line of numbers"),
                        ("d,a\n03/04/2024,1\n04/04/2024,2\n", "days or months may come first"),
                        ("t,a\n0,inf\n1,2\n", 'found "inf"')):
        refused(repr(text), 5, words, write("bad.csv", text))
    refused("units", 5, "in the same units", write("m.csv", "t,a [m]\n0,1\n1,2\n"), write("mm.csv", "t,a [mm]\n0,1\n1,2\n"))
    refused("a spreadsheet", 5, "save its tables as CSV", write("book.csv", b"PK\x03\x04" + bytes(50)))
    refused("no file", 4, "cannot be read", folder / "none.csv", program=True)
    return [german, pandas, spaces, campbell, logger, plain, clock]


def write_matlab_73(path, structs):
    """A file as MATLAB 7.3 writes it: an array of structs is a group of arrays of references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("rw_data")
        for name in structs[0]:
            references = np.empty((len(structs), 1), dtype=h5py.ref_dtype)
            for i, fields in enumerate(structs):
                item = file.create_dataset(f"#refs#/{name}{i}", data=np.asarray(fields[name]).T)
                item.attrs["MATLAB_class"] = np.bytes_("double")
                references[i, 0] = item.ref
            group.create_dataset(name, data=references)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + bytes(2) + b"\x02IM"[:2])


def matlab():
    """50 runs in an array of structs, of different lengths."""
    structs = [{"t": 0.1 * np.arange(5 + k % 3)[:, None], "u": k + np.arange(5 + k % 3)[None, :] / 8.0,
                "xy": np.arange(2.0 * (5 + k % 3)).reshape(-1, 2)} for k in range(50)]
    array = np.empty((1, 50), dtype=object)
    array[0] = structs
    five, seven, single = folder / "five.mat", folder / "seven.mat", folder / "single.mat"
    scipy.io.savemat(five, {"rw_data": array, "note": "a text", "gain": 3.0})
    write_matlab_73(seven, structs)
    for path in five, seven:
        for words in (path,), (path, "--runs", "rw_data"):
            z, t, names, _, _ = imported(path.name, *words, program=len(words) > 1)
            check(names == ["u", "xy_1", "xy_2"] and z.shape == (50, 7, 3), f"{path.name}: {names} {z.shape}")
            for k, fields in enumerate(structs):
                n = 5 + k % 3
                same(f"{path.name}, run {k}", z[k, :n], np.column_stack((fields["u"].ravel(), fields["xy"])))
                check(np.isnan(z[k, n:]).all() and np.isnan(t[k, n:]).all(), f"{path.name}: run {k} is longer than {n}")
    scipy.io.savemat(single, {"s": {"theta": np.arange(8) / 4.0, "x": np.arange(16.0).reshape(2, 8), "flag": 1.0}, "Ts": 0.5,
                              "t": np.arange(8) / 2.0, "rate": np.array([1j, 2])})
    z, t, names, _, said = imported("single", single)
    check(names == ["theta", "x_1", "x_2"], f"single: {names}")
    same("single", z[0, :, 2], np.arange(8.0, 16))
    same("single, times", t, np.arange(8) / 2)
    check("leaves out rate" in said and "leaves out s.flag" in said, f"single: {said}")
    scipy.io.savemat(folder / "steps.mat", {"Ts": 0.25, "y": np.arange(4.0), "a": array, "b": array})
    refused("two arrays", 5, "several arrays of structs: a (50), b (50); choose one with --runs", folder / "steps.mat")
    scipy.io.savemat(folder / "steps.mat", {"Ts": 0.25, "y": np.arange(4.0)})
    z, t, names, _, _ = imported("a sampling time", folder / "steps.mat")
    same("a sampling time", t, [0, 0.25, 0.5, 0.75])
    refused("a text", 4, "cannot be read as a MATLAB file", write("wrong.mat", "no MATLAB file"))
    # Some bytes that declare 3.6 GB: a cell of 450 million elements, and an array of which nothing was written.
    def element(kind, data):
        return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)
    body = element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<ii", 450_000_000, 1)) + element(1, b"c")
    (folder / "bomb.mat").write_bytes(b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + element(14, body))
    refused("a cell of nothing", 5, "its 184 bytes declare more numbers than 1024 MiB hold", folder / "bomb.mat")
    with h5py.File(folder / "fill.mat", "w") as file:
        file.create_dataset("x", (450_000_000, 1), chunks=(1_000_000, 1), dtype="f8")
    refused("an array of nothing", 5, "bytes declare more numbers than 1024 MiB hold", folder / "fill.mat")
    (folder / "lines.csv.gz").write_bytes(gzip.compress(b"1\n" * (100 << 20)))
    refused("lines of nothing", 5, "bytes declare more numbers than", folder / "lines.csv.gz")
    steps = np.empty((1, 4), dtype=object)
    steps[0] = [{"time": np.arange(3.0), "V": np.arange(3.0) + k, "I": np.zeros((0, 0)) if k == 2 else np.ones(3)}
                for k in range(3)] + [{"time": 1.0, "V": 2.0, "I": 3.0}]
    scipy.io.savemat(folder / "cycles.mat", {"data": {"step": steps, "about": "a cell"}})
    z, _, names, _, _ = imported("an empty field", folder / "cycles.mat", "--runs", "step")
    same("an empty field", z, [[[k + i, nan if k == 2 else 1] for i in range(3)] for k in range(3)])
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = np.arange(12.0).reshape(4, 3), np.arange(9.0).reshape(3, 3)
    scipy.io.savemat(folder / "cells.mat", {"runs": cells})
    z, _, names, _, _ = imported("a cell", folder / "cells.mat", "--time", "runs_1")
    check(names == ["runs_2", "runs_3"], f"a cell: {names}")
    same("a cell", z[1, :3], [[1, 2], [4, 5], [7, 8]])
    with h5py.File(folder / "plain.h5", "w") as file:
        file["time"], file["a/x"], file["a/label"], file["b"] = np.arange(4) / 8, np.arange(4) ** 2, "a text", np.ones((4, 2))
    z, t, names, _, _ = imported("plain HDF5", folder / "plain.h5")
    same("plain HDF5", z[0], np.column_stack((np.arange(4) ** 2, np.ones((4, 2)))))
    check(names == ["x", "b_1", "b_2"], f"plain HDF5: {names}")
    return [five, seven, single]


TYPES = """
package vehicle;  // a logger's types, of no program of portmet
struct vector_t { double v[3]; }
struct pose_t {
    const int8_t VERSION = 2, OTHER = 3;
    int64_t utime;
    vector_t position, rate; /* nested */
    int16_t n;
    float echo[n];
    string name;
    boolean valid;
}
struct other.point_t { double x; } 
""".replace("struct other.point_t { double x; } \n", "")
POWER = "package grid;\nstruct power_t { int32_t index; double watt, volt; byte raw[2][2]; vehicle.vector_t place; }\n"


def lcm_log(name, events):
    return write(name, b"".join(struct.pack(">IqqII", 0xEDA1DA01, k, at, len(channel), len(message)) + channel.encode() + message
                                for k, (at, channel, message) in enumerate(events)))


def lcm():
    """Messages that lcm-gen's own code encodes, in a log that is written here, and in one that lcm-logger writes."""
    types = write("types.lcm", TYPES + POWER)
    done = run("lcm-gen", "-p", "--ppath", folder / "made", types)
    check(done.returncode == 0, f"lcm-gen: {done.stderr}")
    sys.path.insert(0, str(folder / "made"))
    import grid
    import vehicle
    start = 1_700_000_000_000_000
    events, poses, powers = [], [], []
    for k in range(20):
        pose = vehicle.pose_t()
        pose.utime, pose.n, pose.echo, pose.name, pose.valid = k * 10000, k % 3, [0.5 * i for i in range(k % 3)], "a", k % 2 == 0
        pose.position.v, pose.rate.v = [k, k / 8, -k], [0.25, 0.5, k]
        power = grid.power_t()
        power.index, power.watt, power.volt, power.raw = -k, k / 16, 12.5, [bytes([k, 1]), bytes([2, 3])]
        power.place.v = [1, 2, 3]
        poses.append([*pose.position.v, *pose.rate.v, k % 3, *[0.5 * i if i < k % 3 else nan for i in range(2)], k % 2 == 0])
        powers.append([-k, k / 16, 12.5, k, 1, 2, 3, 1, 2, 3])
        events += [(start + 10000 * k, "POSE", pose.encode()), (start + 10000 * k + 150, "GRID POWER", power.encode()),
                   (start + 10000 * k + 300, "UNKNOWN", bytes(12))]
    log = lcm_log(LOG, events)
    z, t, names, _, said = imported("an LCM log", "--log", log, "--types", types, program=True)
    column = {name: i for i, name in enumerate(names)}
    wanted = [f"POSE.{g}.v_{i}" for g in ("position", "rate") for i in range(3)] + ["POSE.n", "POSE.echo_0", "POSE.echo_1", "POSE.valid"]
    check(set(wanted) <= set(names), f"an LCM log: {names}")
    if set(wanted) <= set(names):
        same("an LCM log, POSE", z[0][:, [column[name] for name in wanted]], poses)
        other = ["index", "watt", "volt", "raw_0_0", "raw_0_1", "raw_1_0", "raw_1_1", "place.v_0", "place.v_1", "place.v_2"]
        same("an LCM log, POWER", z[0][:, [column[f"GRID_POWER.{name}"] for name in other]], powers)
    check(t.shape == (20,) and np.allclose(t, 0.01 * np.arange(20)), f"an LCM log: times {t}")
    check("leaves out 20 messages of UNKNOWN" in said, f"an LCM log: {said}")
    pose_log = lcm_log("pose", [event for event in events if event[1] == "POSE"])
    _, t, names, _, said = imported("one channel", pose_log, "--types", types)
    check("times are those of the field utime" in said and "POSE.utime" not in names, f"one channel: {said}")
    _, _, names, units, _ = imported("units", "--log", log, "--types", types, "--units", "POSE.rate.v_0=rad/s, GRID_POWER.watt=W",
                                     program=True)
    units = dict(zip(names, units))
    check([units.get(name) for name in ("POSE.rate.v_0", "GRID_POWER.watt", "POSE.n")] == ["rad/s", "W", ""], f"units: {units}")
    refused("units of no column", 5, 'no column "POSE.q" (--units)', log, "--types", types, "--units", "POSE.q=m", program=True)
    for wrong in "POSE.n", "=m", "POSE.n=", "POSE.n=m,POSE.n=m":
        refused("wrong units", 2, "--units: expected NAME=UNIT", log, "--types", types, "--units", wrong)
    _, t, _, units, _ = imported("units of a text", write("plain.csv", "t,x,a=b\n0,1,2\n20,3,4\n"), "--units", "t=ms,a=b=m/s")
    same("units of a text, times", t, [0, 0.02])
    check(units == ["", "m/s"], f"units of a text: {units}")
    refused("no types", 5, "by portmet-train import --log LOG --types FILE.lcm", log)
    for words in (["inspect", log], ["propose", "--data", log, "-o", folder / "arm"]):
        done = run(train, *words)
        check(done.returncode == 5 and "make a dataset of it by portmet-train import --log" in done.stderr, f"{words[0]}: {done.stderr}")
    refused("other types", 5, "no message has a type", log, "--types", write("wrong.lcm", "struct pose_t { int64_t utime; }"))
    refused("no types file", 5, "wrong.lcm:1: expected", log, "--types", write("wrong.lcm", "struct pose_t { int64_t utime }"))
    run("lcm-gen", "-p", "--ppath", folder / "made", "lcmtypes/portmet.lcm")
    import portmet
    known, _ = reader.lcm_log.read_types(["lcmtypes/portmet.lcm"])
    for name in ("flux", "report", "tick", "ledger"):
        own = int.from_bytes(getattr(portmet, f"{name}_t")._get_packed_fingerprint(), "big")
        check(own in known, f"the fingerprint of portmet.{name}_t")
    logged(events, types, poses, wanted)
    return [log], types


def logged(events, types, poses, wanted):
    """A log by lcm-logger, where a private network can be made."""
    script = folder / "publish.py"
    script.write_text(f"""import pickle, socket, struct, subprocess, sys, time
logger = subprocess.Popen(['lcm-logger', '-q', '-f', sys.argv[1]], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
time.sleep(0.5)
for k, (_, channel, message) in enumerate(pickle.load(open(sys.argv[2], 'rb'))):
    out.sendto(struct.pack('>II', 0x4c433032, k) + channel.encode() + b'\\0' + message, ('239.255.76.67', {LCM_PORT}))
    time.sleep(0.001)
time.sleep(0.5)
logger.terminate()
logger.wait()
""")
    import pickle
    (folder / "events").write_bytes(pickle.dumps(events))
    private = next((["unshare", option, "sh", "daemon/loopback.sh"] for option in ("-n", "-rn")
                    if run("unshare", option, "sh", "daemon/loopback.sh", "true").returncode == 0), None)
    if private is None:
        print("no private network: lcm-logger is not tried")
        return
    recorded = folder / "recorded"
    done = run(*private, sys.executable, script, recorded, folder / "events")
    check(done.returncode == 0 and recorded.exists(), f"lcm-logger: {done.stderr}")
    z, t, names, _, _ = imported("a log of lcm-logger", recorded, "--types", types)
    rows = z[0][:, [names.index(name) for name in wanted]]
    same("a log of lcm-logger", rows[~np.isnan(rows[:, 0])], poses)


def own_files():
    """A recording and datasets of portmet."""
    recording = folder / "recording.h5"
    done = run(daemon, "run", "configs/double_pendulum.yaml", "--in-process", "--steps", "4", "--quiet", "--record", recording)
    check(done.returncode == 0, f"portmetd run: {done.stderr}")
    z, t, names, units, _ = imported("a recording", recording)
    with h5py.File(recording) as file:
        same("a recording", z[0], np.column_stack([file[f"subsystems/{part}/z"][()] for part in file["subsystems"]]))
        same("a recording, times", t, file["time"][()])
    check("upper.q_0" in names and units[names.index("upper.q_0")] == "m", f"a recording: {names} {units}")
    reference = "configs/reference/double_pendulum.h5"
    z, _, names, _, _ = imported("two datasets", reference, reference)
    with h5py.File(reference) as file:
        same("two datasets", z, np.concatenate((file["z"][()], file["z"][()])))


def options():
    """Tables where a dataset is read."""
    csv = folder / "pendulum.csv"
    with h5py.File("configs/reference/double_pendulum.h5") as file:
        names = file.attrs["state_layout"].decode().split()
        rows = np.column_stack((file["t"][()], file["z"][0]))[:40]
    scene = pathlib.Path("configs/double_pendulum.yaml").resolve()
    millimetres = [f"{name} [mm]" if name.startswith("q") else name for name in names]
    scaled = rows * [1, *(1000 if name.startswith("q") else 1 for name in names)]
    write("pendulum.csv", "t," + ",".join(names) + "\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist()))
    write("mm.csv", "t," + ",".join(millimetres) + "\n" + "\n".join(",".join(map(repr, row)) for row in scaled.tolist()))
    for words in ([scene, "--data", csv], ["--data", csv, scene]):
        done = run(train, "evaluate", *words, "--until", "3")
        check(done.returncode == 0 and "Both laws" in done.stdout, f"evaluate: {done.stdout} {done.stderr}")
    done = run(train, "evaluate", scene, "--data", folder / "mm.csv", "--record", folder / "predicted.h5")
    check(done.returncode == 0 and "converts q1x from mm to m" in done.stdout, f"evaluate: {done.stdout} {done.stderr}")
    with h5py.File(folder / "predicted.h5") as file:
        check(np.allclose(file["z"][0], scaled[:, 1:], rtol=1e-3, atol=1e-3 * np.abs(scaled[:, 1:]).max(0)),
              "evaluate --record: expected the units of the data")
        check(file.attrs["units"].decode().startswith("mm;"), f"evaluate --record: units {file.attrs['units']}")
    lines = csv.read_text().split("\n")
    short = write("short.csv", "\n".join(lines[:20]))
    done = run(train, "evaluate", scene, "--data", csv, short)
    check(done.returncode == 0 and "Both laws" in done.stdout, f"evaluate, another length: {done.stdout} {done.stderr}")
    done = run(train, "evaluate", scene, "--data", csv, csv, "--json")
    check(done.returncode == 0 and done.stdout.startswith("{"), f"evaluate --json: {done.stdout[:80]} {done.stderr}")
    done = run(train, "inspect", csv, csv)
    check("2 trajectories of 11.7 to 11.7 s" in done.stdout, f"inspect: {done.stdout} {done.stderr}")
    done = run(train, "propose", scene, "--data", csv, csv, "-o", folder / "draft.yaml", "--budget", "0")
    check(done.returncode == 0 and (folder / "draft_data.h5").exists(), f"propose: {done.stdout} {done.stderr}")
    check("draft_data.h5" in (folder / "draft.yaml").read_text(), "propose: expected the dataset in the training file")
    before = set(os.listdir(tempfile.gettempdir()))
    run(train, "evaluate", scene, "--data", csv)
    left = [name for name in set(os.listdir(tempfile.gettempdir())) - before if name.startswith("portmet-data-")]
    check(not left, f"evaluate left {left}")


def without_packages():
    """The error where Python has no packages names them."""
    empty = folder / "empty"
    empty.mkdir()
    (empty / "python3").symlink_to("/usr/bin/python3")
    (empty / "h5py.py").write_text("raise ImportError('none', name='h5py')\n")
    done = run(train, "import", folder / "pandas.csv", "-o", folder / "no.h5",
               env={**os.environ, "PYTHONPATH": str(empty), "PATH": f"{empty}:/usr/bin:/bin"})
    check(done.returncode == 4 and "apt-get install python3-h5py" in done.stderr and done.stderr.count("\n") == 1,
          f"no h5py: exit code {done.returncode}, {done.stderr}")
    done = run(train, "import", folder / "pandas.csv", "-o", folder / "no.h5", env={"PATH": str(folder / "nowhere")})
    check(done.returncode == 4 and "apt-get install python3" in done.stderr, f"no python3: {done.returncode}, {done.stderr}")


def damage(texts, binaries, types):
    """Files that are cut, and files with wrong bytes. The readers of texts and logs are called here, without a catch of
    last resort; HDF5 files are left to the program, as damaged ones can end a process."""
    import argparse
    import table
    table.say = reader.say = reader.text.say = reader.lcm_log.say = reader.matlab.say = lambda text: None
    how = argparse.Namespace(time=None, dt=None, missing=None, runs=None, types=[str(types)], units={})
    draw = random.Random(7)
    bad, read = folder / "damaged", 0
    for path in texts:
        whole = path.read_bytes()
        for _ in range(60):
            data = bytearray(whole[:draw.randrange(len(whole) + 1)] if draw.random() < 0.5 else whole)
            for _ in range(draw.randrange(6)):
                if data:
                    data[draw.randrange(len(data))] = draw.choice((draw.randrange(256), *b",;\n\t 0-:\""))
            bad.write_bytes(data)
            try:
                for found in reader.read(str(bad), how):
                    reader.clean(found, how)
                read += 1
            except table.Refused as error:
                check(error.code in (4, 5) and "\n" not in str(error), f"damaged {path.name}: {error}")
            except Exception as error:  # what nobody thought of
                shutil.copy(bad, f"{bad}.{path.name}")
                check(False, f"damaged {path.name}: {type(error).__name__}: {error}: {bytes(data)[:300]!r}")
    check(read > 20, f"only {read} damaged files were read at all")
    for path in binaries:
        whole = path.read_bytes()
        for kind in range(2):
            data = bytearray(whole[:len(whole) // 2] if kind == 0 else whole)
            for _ in range(200 * kind):
                data[draw.randrange(len(data))] = draw.randrange(256)
            bad = folder / ("damaged" + path.suffix)
            bad.write_bytes(data)
            done = run(train, "import", bad, "-o", folder / "out.h5")
            check(done.returncode in (0, 4, 5) and "Traceback" not in done.stderr and
                  done.stderr.count("\n") == (done.returncode != 0), f"damaged {path.name}: {done.returncode}, {done.stderr}")


def main():
    before = time.monotonic()
    texts = tables()
    binaries = matlab()
    logs, types = lcm()
    own_files()
    options()
    without_packages()
    damage(texts + logs, binaries, types)
    shutil.rmtree(folder)
    print(f"{time.monotonic() - before:.1f} s", "all well" if not failures else f"{len(failures)} failures")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
