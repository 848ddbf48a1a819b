"""Writes settings.md and scene-fields.md beside this file from what the program says: generate.py KERF_SERVER."""

import json
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent

SETTINGS = """# Settings of the server

<!-- Written by `make reference`. -->

The output of `kerf-server serve --print-config`: every setting with its default and the reason for it. Save it, change it, and
pass it with `--config FILE`. A setting can also be a variable (`KERF_SESSION__LEASE_S=3`) or a flag
(`--set session.lease_s=3`). [The server](server.md) explains them. Settings whose default depends on the machine are not listed
with a value.

```toml
{toml}```
"""

FIELDS = """# Fields of a scene

<!-- Written by `make reference`. -->

Every field of a scene file, from `kerf-server schema`. [Scenes](scenes.md) explains how they work together. A type in another
table links to it.
"""


def said(program, *arguments):
    return subprocess.run([program, *arguments], capture_output=True, text=True, check=True).stdout


def cell(text):
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")


def anchor(name):
    return f"[{name}](#{name.lower()})"


def kind(schema):
    """A type in words."""
    if "$ref" in schema:
        return anchor(schema["$ref"].rsplit("/", 1)[1])
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"] if value is not None)
    for choice in ("anyOf", "oneOf", "allOf"):
        if choice in schema:
            return " or ".join(dict.fromkeys(kind(one) for one in schema[choice] if one.get("type") != "null"))
    name = schema.get("type", "any")
    if isinstance(name, list):
        name = " or ".join(one for one in name if one != "null")
    if name == "array":
        items = kind(schema["items"]) if isinstance(schema.get("items"), dict) else "any"
        length = schema.get("minItems") if schema.get("minItems") == schema.get("maxItems") else None
        return f"{length} of {items}" if length else f"list of {items}"
    return name


def fields(schema):
    required = schema.get("required", [])
    for name, field in schema.get("properties", {}).items():
        must = "required" if name in required else ""
        yield f"| `{name}` | {kind(field)} | {must} | {cell(field.get('description', ''))} |"


def table(name, schema, level):
    lines = [f"\n{'#' * level} {name}\n"]
    if description := schema.get("description"):
        lines += [cell(description) + "\n"]
    rows = list(fields(schema))
    for choice in schema.get("oneOf", []):
        if choice.get("properties"):
            rows += [row.replace("| required |", "| one of |") for row in fields(choice)]
        else:
            rows += [f"| {kind(choice)} | word | one of | {cell(choice.get('description', ''))} |"]
    if rows:
        lines += ["| field | type | | meaning |", "|---|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def main():
    program = sys.argv[1]
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else FOLDER
    toml = said(program, "serve", "--print-config")
    (folder / "settings.md").write_text(SETTINGS.format(toml=toml), encoding="utf-8")
    schema = json.loads(said(program, "schema"))
    text = FIELDS + table("Scene", schema, 2)
    text += "".join(table(name, one, 2) for name, one in sorted(schema["$defs"].items()))
    (folder / "scene-fields.md").write_text(text, encoding="utf-8")


main()
