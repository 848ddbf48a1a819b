"""Which modules of a crate or client import which: imports.py [--circles] FOLDER...

Prints a drawing (Mermaid) of each folder's modules, a file or a folder of files each. With --circles it prints the groups
of modules of one folder, at any depth, that import each other, and ends with 1 if there are any. What a module hands on
(`pub use`) counts as the module's that has it. A folder's own file, as mod.rs, and the files below it may import each other.
"""

import ast
import re
import sys
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
        of_folders = graphs(folder)
        if only_circles:
            for where, edges in of_folders.items():
                for group in circles(edges):
                    found = True
                    print(f"{folder.joinpath(*where)}: these import each other: {', '.join(group)}")
            continue
        print(f"%% {folder}\nflowchart LR")
        print("\n".join(f"  {name} --> {to}" for name, tos in of_folders.get((), {}).items() for to in sorted(tos)))
    return int(found)


sys.exit(main())
