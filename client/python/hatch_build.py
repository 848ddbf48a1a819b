"""Compiles the `.proto` files to `src/kerf/v1` when the package is built or installed. No protoc is needed."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompileProtos(BuildHookInterface[Any]):
    """Runs before every build, also of an editable one."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Writes a module and its types for each file."""
        from grpc_tools import protoc

        here = Path(self.root)
        # In the repository, or in a source distribution, which brings them along.
        folder = next((p for p in (here / "proto", here / "../../proto") if (p / "kerf/v1").is_dir()), None)
        if folder is None:
            raise FileNotFoundError(f"no kerf/v1/*.proto in {here}/proto or {here}/../../proto")
        out = here / "src"
        sources = sorted(str(path) for path in (folder / "kerf/v1").glob("*.proto"))
        includes = [f"-I{folder}", f"-I{files('grpc_tools') / '_proto'}"]
        outputs = [f"--python_out={out}", f"--pyi_out={out}"]
        if protoc.main(["protoc", *includes, *outputs, *sources]) != 0:
            raise RuntimeError("the .proto files cannot be compiled")
        (out / "kerf/v1/__init__.py").write_text('"""The messages of the wire, made of the `.proto` files."""\n')
