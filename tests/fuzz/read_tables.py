"""read_tables.py: reads the tables at each path that stands on a line of standard input, and answers with a line: the
exit code of the reader of tables, and the number of lines of its error."""
import contextlib
import importlib.util
import io
import os
import sys

if importlib.util.find_spec("h5py") is None and sys.executable != "/usr/bin/python3":
    os.execv("/usr/bin/python3", ["/usr/bin/python3", "-B", *sys.argv])  # as the reader does (tables/__main__.py)
ROOT = os.path.join(os.path.dirname(os.path.realpath(__file__)), "../..")
sys.path.insert(0, os.path.join(ROOT, "daemon/python/portmet/tables"))
import reader  # noqa: E402

for path in sys.stdin:
    path = path.rstrip("\n")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as error:
        code = reader.main([path + ".h5", f"--types={ROOT}/lcmtypes", "--", path])
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path + ".h5")
    print(code, len(error.getvalue().splitlines()), flush=True)
