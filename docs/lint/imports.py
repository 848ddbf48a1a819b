"""Which modules of a crate or client import which: imports.py [--check] [--crates PAGE] FOLDER...

Prints a drawing (Mermaid) of each folder's modules, a file or a folder of files each, and writes one of the crates of the
workspace between two lines of PAGE. With --check it writes nothing: it prints the groups of modules of one folder, at any
depth, that import each other, and whether PAGE has another drawing, and ends with 1 if there is any of it. What a module
hands on (`pub use`) counts as the module's that has it. A folder's own file, as mod.rs, and the files below it may import
each other.
"""

import argparse
import ast
import re
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

# Files that stand for the folder that they are in.
ROOTS = ("lib", "main", "mod", "__init__")

# An item for tests alone: of one line, or to the brace that closes it.
TEST = re.compile(r"^( *)#\[cfg\(test\)\]\n(?: *#\[.*\n)*(?:.*[;,}]\n|(?:.*\n)*?\1\}\n)", re.MULTILINE)
USE = re.compile(r"^\s*(?:pub(?:\(.*?\))? )?use ([^;]+);", re.MULTILINE)
BRACES = re.compile(r"([\w:]*)\{([^{}]*)\}")
PATH = re.compile(r"\b(?:crate|super)(?:::\w+)+")
SCRIPT = re.compile(r"""(?:\bfrom|\bimport|\bimport\(|\bnew URL\()\s*["'](\.{1,2}/[^"']+)["']""")


def module(path, folder):
    """Where a file is within its crate: the folders' names and its own."""
    *parents, name = path.relative_to(folder).parts
    name = re.sub(r"\.(rs|ts|js|py)$", "", name)
    return (*parents, name) if name not in ROOTS else tuple(parents)


# These yield where each thing that a file imports is looked for, and the name by which the file may hand it on.


def rust_imports(path, here, folder):
    text = re.sub(r"//.*", "", TEST.sub("", path.read_text(encoding="utf-8")))
    found = PATH.findall(USE.sub("", text))
    for tree in USE.findall(text):
        while "{" in tree:
            tree = BRACES.sub(lambda m: ",".join(m[1] + one.strip() for one in m[2].split(",") if one.strip()), tree)
        found += tree.split(",")
    for one in found:
        whole, _, alias = one.strip().removesuffix("::self").partition(" as ")
        parts = whole.split("::")
        name = alias or parts[-1]
        at = () if parts[0] == "crate" else here
        while parts and parts[0] in ("crate", "self", "super"):
            at = at[:-1] if parts.pop(0) == "super" else at
        yield (*at, *parts), name


def script_imports(path, here, folder):
    for target in SCRIPT.findall(path.read_text(encoding="utf-8")):
        whole = (path.parent / target).resolve()
        if whole.is_relative_to(folder):
            yield module(whole, folder), ""


def python_imports(path, here, folder):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            package = (node.module or "").split(".") if isinstance(node, ast.ImportFrom) else []
            yield from (((*package, *one.name.split(".")), one.asname or one.name) for one in node.names)


READERS = {".rs": rust_imports, ".ts": script_imports, ".py": python_imports}


def graphs(folder):
    """By folder, the whole one first, given by where it is: its modules to those of them that they import."""
    folder = folder.resolve()
    found = defaultdict(list)
    for path in sorted(folder.rglob("*.*")):
        if path.suffix in READERS and "gen" not in path.parts:
            here = module(path, folder)
            found[here] += READERS[path.suffix](path, here, folder)
    modules = {here[:end] for here in found for end in range(len(here) + 1)}
    handed_on = {(*here, name): target for here, targets in found.items() for target, name in targets}

    def owner(target):
        """The module that has what is looked for there."""
        # So often at most may it be handed on.
        for _ in range(9):
            end = next(end for end in range(len(target), -1, -1) if target[:end] in modules)
            if end == len(target) or target[: end + 1] not in handed_on:
                break
            target = (*handed_on[target[: end + 1]], *target[end + 1 :])
        return target[:end]

    edges = defaultdict(dict)
    for *parents, name in sorted(modules - {()}):
        edges[tuple(parents)][name] = set()
    for here, targets in found.items():
        for to in (owner(target) for target, _ in targets):
            apart = next((depth for depth, (a, b) in enumerate(zip(here, to)) if a != b), None)
            if apart is not None:
                edges[here[:apart]][here[apart]].add(to[apart])
    return dict(sorted(edges.items()))


def reach(start, edges):
    """What is reached from there."""
    seen, left = set(), [start]
    while left:
        for to in edges[left.pop()] - seen:
            seen.add(to)
            left.append(to)
    return seen


def circles(edges):
    """Groups of modules of which each reaches each."""
    reached = {name: reach(name, edges) for name in edges}
    groups = {frozenset(b for b in reached[a] if a in reached[b]) for a in edges if a in reached[a]}
    return sorted(sorted(group) for group in groups)


def crates(root, *kinds):
    """Crates of the workspace: those that each depends on, by these tables of its manifest."""
    members = tomllib.loads((root / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["members"]
    manifests = [tomllib.loads((root / one / "Cargo.toml").read_text(encoding="utf-8")) for one in members]
    of_names = {one["package"]["name"]: [one, *one.get("target", {}).values()] for one in manifests}
    return {
        name: {to for table in tables for kind in kinds for to in table.get(kind, {}) if to in of_names}
        for name, tables in of_names.items()
    }


def crates_drawing(root):
    """The drawing of the crates, without arrows that follow from others."""
    needed = crates(root, "dependencies", "build-dependencies")
    tests_needed = crates(root, "dev-dependencies")
    through = {name: reach(name, needed) for name in needed}
    lines = []
    for name, tos in needed.items():
        for arrow, direct in (("-->", tos), ("-.->", tests_needed[name] - tos)):
            follow = {to for to in direct for other in tos | direct if to in through[other]}
            lines += [f"  {name} {arrow} {to}" for to in sorted(direct - follow)]
    return "\n".join(["```mermaid", "flowchart LR", *lines, "```"]).replace("kerf-", "")


# The drawing stands between these lines.
BEGIN, END = "<!-- crates: written by `make imports` -->\n", "\n<!-- end of crates -->"


def with_drawing(text, drawing):
    before, _, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        sys.exit(f"no lines {BEGIN.strip()} and {END.strip()}")
    return before + BEGIN + drawing + END + after


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--crates", metavar="PAGE", type=Path)
    parser.add_argument("folders", metavar="FOLDER", nargs="*", type=Path)
    options = parser.parse_args()
    found = False
    if options.crates:
        text = options.crates.read_text(encoding="utf-8")
        new = with_drawing(text, crates_drawing(Path(__file__).parents[2]))
        if not options.check:
            options.crates.write_text(new, encoding="utf-8")
        elif new != text:
            found = True
            print(f"{options.crates}: its drawing of crates is not that of the manifests; run `make imports`")
    for folder in options.folders:
        of_folders = graphs(folder)
        if options.check:
            for where, edges in of_folders.items():
                for group in circles(edges):
                    found = True
                    print(f"{folder.joinpath(*where)}: these import each other: {', '.join(group)}")
            continue
        print(f"%% {folder}\nflowchart LR")
        print("\n".join(f"  {name} --> {to}" for name, tos in of_folders.get((), {}).items() for to in sorted(tos)))
    return int(found)


sys.exit(main())
