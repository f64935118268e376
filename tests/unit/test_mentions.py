#!/usr/bin/env python3
"""test_mentions.py: every source file and link that a page or a comment names is there. Runs in the repository's root.

A source file may be named by the end of its path: `codec.c`, `lockstep/codec.c`. Links of pages lead to files and to
headings that exist.
"""
import pathlib
import re
import sys

# No files of this repository: placeholders (NAME, one letter), what programs and readers of a page make, fdlibm's.
FOREIGN = re.compile(
    r"[A-Z]{4}|(^|/)\w\.\w+$|portmet_\w+\.[ch]$|(^|/)(listen|circuit|assemble|example|model|file|included|errors)\.\w+$"
    r"|^double_pendulum\.[ch]$|^[es]_log(1p)?\.c$"
)
MENTION = re.compile(r"(?<![\w./*{$<-])((?:[\w-]+/)*[\w-]+\.(?:c|h|sh|py|lcm|gp|cmake))(?![\w/*-])")
PLACE = re.compile(r"(?<![\w./*{$<-])((?:daemon|trainer|tests|lcmtypes)/[\w./-]*\w)(?![\w/*{-])")
LINK = re.compile(r"\]\(([^)\s]+)\)")
COMMENT = {".c": re.compile(r"//[^\n]*"), ".h": re.compile(r"//[^\n]*")}
HASH = re.compile(r"(?m)^\s*#[^\n]*")


def slug(heading):
    """The anchor that a heading gets."""
    heading = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", heading).replace(" ", "-")


def anchors(page):
    text = re.sub(r"(?ms)^```.*?^```", "", page.read_text())
    return {slug(heading) for heading in re.findall(r"(?m)^#+ (.*)$", text)}


def main():
    files = [path for path in pathlib.Path(".").rglob("*") if path.is_file() and not path.parts[0].startswith(("build", ".git"))]
    ends = {"/".join(path.parts[i:]) for path in files for i in range(len(path.parts))}
    missing = []
    checked = 0
    for path in files:
        if path.suffix == ".md":
            text = path.read_text()
            for target in LINK.findall(text):
                if re.match(r"\w+:", target):
                    continue
                checked += 1
                name, _, anchor = target.partition("#")
                to = (path.parent / name) if name else path
                if not to.exists():
                    missing.append(f"{path}: the link {target} leads nowhere")
                elif anchor and to.suffix == ".md" and anchor not in anchors(to):
                    missing.append(f"{path}: {target}: there is no such heading")
        elif path.suffix in COMMENT:
            text = "\n".join(COMMENT[path.suffix].findall(path.read_text()))
        elif path.suffix in (".sh", ".py", ".cmake") or path.name == "CMakeLists.txt":
            text = "\n".join(HASH.findall(path.read_text()))
        else:
            continue
        for name in MENTION.findall(text) + PLACE.findall(text):
            checked += 1
            if name not in ends and not pathlib.Path(name).exists() and not FOREIGN.search(name):
                missing.append(f"{path}: there is no {name}")
    if checked < 300:
        missing.append(f"expected some hundred mentions, found {checked}")
    print(*(f"FAILED: {line}" for line in sorted(set(missing))), f"{checked} mentions and links", sep="\n")
    sys.exit(bool(missing))


if __name__ == "__main__":
    main()
