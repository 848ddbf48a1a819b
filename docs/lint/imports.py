"""Which modules of a crate or client import which: imports.py [--circles] FOLDER...

Prints a drawing (Mermaid) of each folder's modules, a file or a folder of files each. With --circles it prints the groups
of modules that import each other, and ends with 1 if there are any.
"""

import re
import sys
from pathlib import Path

SCRIPT = re.compile(r"""from\s+["'](\.{1,2}/[^"']+)["']""")


def module(path, folder):
    """The first part of a file's path within its crate."""
    return path.relative_to(folder).parts[0].removesuffix(".rs").removesuffix(".ts")


def rust_imports(path, names):
    text = re.sub(r"//.*", "", path.read_text(encoding="utf-8").split("#[cfg(test)]")[0])
    found = set(re.findall(r"\bcrate::(\w+)", text))
    for group in re.findall(r"\buse crate::\{(.*?)\};", text, re.DOTALL):
        found |= set(re.findall(r"(?:^|,)\s*(\w+)", re.sub(r"\{[^{}]*\}", "", group)))
    return found & names


def script_imports(path, folder, names):
    for target in SCRIPT.findall(path.read_text(encoding="utf-8")):
        whole = (path.parent / target).resolve()
        if whole.is_relative_to(folder):
            yield from {whole.relative_to(folder).parts[0].removesuffix(".js").removesuffix(".ts")} & names


def graph(folder):
    """Module to modules that it imports."""
    folder = folder.resolve()
    files = [p for p in [*folder.rglob("*.rs"), *folder.rglob("*.ts")] if "gen" not in p.parts]
    names = {module(path, folder) for path in files}
    edges = {name: set() for name in sorted(names)}
    for path in files:
        found = rust_imports(path, names) if path.suffix == ".rs" else script_imports(path, folder, names)
        edges[module(path, folder)] |= set(found) - {module(path, folder)}
    for root in ("lib", "main"):
        edges.pop(root, None)
    return {name: {to for to in found if to in edges} for name, found in edges.items()}


def circles(edges):
    """Groups of modules of which each reaches each."""

    def reach(start):
        seen, left = set(), [start]
        while left:
            for to in edges[left.pop()] - seen:
                seen.add(to)
                left.append(to)
        return seen

    reached = {name: reach(name) for name in edges}
    groups = {frozenset(b for b in reached[a] if a in reached[b]) for a in edges if a in reached[a]}
    return sorted(sorted(group) for group in groups)


def main():
    only_circles = "--circles" in sys.argv
    found = False
    for folder in (Path(one) for one in sys.argv[1:] if one != "--circles"):
        edges = graph(folder)
        if only_circles:
            for group in circles(edges):
                found = True
                print(f"{folder}: these import each other: {', '.join(group)}")
            continue
        print(f"%% {folder}\nflowchart LR")
        print("\n".join(f"  {name} --> {to}" for name, tos in edges.items() for to in sorted(tos)))
    return int(found)


sys.exit(main())
