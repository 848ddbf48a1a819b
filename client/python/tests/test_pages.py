"""The lines of Python on the pages are run as they stand there."""

import os
import re
import subprocess
import sys

import pytest
from conftest import PROGRAM, REPOSITORY, station

RAY = "docs/how-to/ray.md"
STATION = "docs/how-to/station.md"
PAGES = ["README.md", "docs/tutorial/README.md", "docs/how-to/python.md", "client/python/README.md", STATION, RAY]


def blocks(page, language):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def test_there_are_lines_to_run():
    assert all(blocks(page, "python") for page in PAGES)


@pytest.fixture
def folder(tmp_path):
    """A folder as whoever follows the pages has it: what the tutorial has saved, and the program where it is built."""
    (tmp_path / "block.toml").write_text(blocks("docs/tutorial/README.md", "toml")[0])
    built = tmp_path / "target/release"
    built.mkdir(parents=True)
    (built / "kerf-server").symlink_to(PROGRAM)
    return tmp_path


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=pytest.mark.xdist_group("cluster")) if page == RAY else page for page in PAGES]
)
def test_the_lines_of_a_page_run(page, folder, server, request):
    if page == RAY:
        request.getfixturevalue("cluster")
    if page == STATION:
        pytest.importorskip("mcap")
        # As the page tells to make one.
        recording = station(server, "--duration", "1", "--log", folder / "run.mcap")
        subprocess.run(recording, check=True, capture_output=True, timeout=60)
    for number, block in enumerate(blocks(page, "python")):
        # What goes on from a block before begins with what that one has. The server that runs already runs here.
        running = block.replace("127.0.0.1:50051", server.address)
        program = "\n".join(_needed(page, number)) + "\n" + running
        path = os.pathsep.join([str(folder / "target/release"), os.environ["PATH"]])
        environment = {**os.environ, "PATH": path}
        ran = subprocess.run(
            [sys.executable, "-c", program],
            check=False,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert ran.returncode == 0, f"{page}, block {number}:\n{block}\n{ran.stderr}"


def _needed(page, number):
    """Lines that a page states before a block, as prose or in a block that went before."""
    if page == "client/python/README.md" and number > 0:
        return [
            "import numpy as np, kerf",
            "down = np.array([[0, 0.057, 0, 0, 0, 0, 1], [0, 0.03, 0, 0, 0, 0, 1]])",
            "server = kerf.LocalServer('target/release/kerf-server')",
            "import atexit; atexit.register(server.stop)",
            "client = server.client()",
        ]
    return []


def test_the_generated_pages_are_what_the_program_says(tmp_path):
    """`make reference` writes them."""
    script = REPOSITORY / "docs/reference/generate.py"
    subprocess.run([sys.executable, script, PROGRAM, tmp_path], check=True, timeout=60)
    for page in ["settings.md", "scene-fields.md"]:
        assert (tmp_path / page).read_text() == (REPOSITORY / "docs/reference" / page).read_text(), page
