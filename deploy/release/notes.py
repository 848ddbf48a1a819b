"""Prints what CHANGELOG.md says of a version, for its release: notes.py VERSION, from the project's folder.

Ends with 1 where a file states another version, or the changelog has no section of it.
"""

import json
import re
import sys
import tomllib
from pathlib import Path


def stated(root):
    """The version in each file that states one."""
    with (root / "Cargo.toml").open("rb") as file:
        yield "Cargo.toml", tomllib.load(file)["workspace"]["package"]["version"]
    with (root / "client/python/pyproject.toml").open("rb") as file:
        yield "client/python/pyproject.toml", tomllib.load(file)["project"]["version"]
    for package in ["client/web/package.json", "client/unity/package.json"]:
        yield package, json.loads((root / package).read_text(encoding="utf-8"))["version"]
    for pattern, paths in [
        (r"^version: (\S+)$", [root / "CITATION.cff"]),
        (r"newTag: ([^\s},]+)", sorted(root.glob("deploy/kubernetes/*/kustomization.yaml"))),
    ]:
        for path in paths:
            for version in re.findall(pattern, path.read_text(encoding="utf-8"), re.MULTILINE):
                yield path.relative_to(root), version


def section(changelog, version):
    """The text below `## VERSION`, with a date behind it or without; None where there is no such heading."""
    found = re.search(rf"^## {re.escape(version)}(?: [^\n]*)?\n(.*?)(?=^## |\Z)", changelog, re.MULTILINE | re.DOTALL)
    return found and found[1].strip()


def main():
    version, root = sys.argv[1].removeprefix("v"), Path()
    others = [f"{path} states {other}, not {version}" for path, other in stated(root) if other != version]
    if others:
        sys.exit("\n".join(others))
    notes = section((root / "CHANGELOG.md").read_text(encoding="utf-8"), version)
    if not notes:
        sys.exit(f"CHANGELOG.md has no section `## {version}`, or nothing in it")
    print(notes)


if __name__ == "__main__":
    main()
