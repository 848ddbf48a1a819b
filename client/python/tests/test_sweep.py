import csv
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import BLOCK, PROGRAM, down

import kerf
from kerf.table import Table

pytest.importorskip("ray", reason="Ray is missing: pip install 'kerf[ray]'")
sweep = pytest.importorskip("kerf.sweep")

STIFFNESS = "scene.objects[0].material.young_modulus_pa"
#: A blade through the block, as `down` has it, softer and harder.
AXES = {
    "scene": str(BLOCK),
    "level": [1, 2],
    "step_rate_hz": 250.0,
    STIFFNESS: [2.0e4, 40000],
    "x_m": 0.0,
    "y_m": 0.012,
    "z_m": 4e-4,
    "depth_m": 0.02,
    "speed_m_per_s": 0.2,
}


@pytest.fixture
def table(tmp_path):
    return tmp_path / "table.csv"


def rows_of(table):
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_each_node_works_and_the_bits_are_those_of_a_plain_session(cluster, client, table):
    points = sweep.grid(AXES)
    assert sweep.run(table, points) == (4, 0, 0)
    rows = rows_of(table)
    assert {row["node"] for row in rows} == {node.node_id for node in cluster.list_all_nodes()}
    assert len({row["state_hash"] for row in rows}) == len(rows) == 4
    for row in rows:
        stiffness_pa = float(row[STIFFNESS])
        toml = BLOCK.read_text().replace("3.0e4", repr(stiffness_pa))
        with client.create_session(toml=toml, level=int(row["level"]), step_rate_hz=250.0) as session:
            assert session.scene.objects[0].young_modulus_pa == stiffness_pa
            result = session.drive([0.0, 0.1], down())
        assert row["state_hash"] == f"{result.state_hash:016x}"
        assert float(row["fracture_j"]) == result.energy.fracture_j > 0.0
        assert float(row["peak_force_n"]) == np.linalg.norm(result.force_n[:, 0], axis=1).max()
        assert (row["server_version"], row["error"]) == (client.server_version(), "")


KILLED = """
import sys, time
from kerf import sweep

scene, table, calls = sys.argv[1:]

def waits(session, point):
    with open(calls, "a") as file:
        file.write(f"{point['seed']}\\n")
    time.sleep(0.2)
    return {"steps": int(session.step(3).steps[-1])}

print(sweep.run(table, sweep.grid({"scene": scene, "seed": range(12)}), waits, ["steps"]))
"""


@pytest.mark.usefixtures("cluster")
def test_a_killed_sweep_goes_on_with_the_points_that_are_missing(table, tmp_path):
    calls = tmp_path / "calls"
    command = [sys.executable, "-c", KILLED, BLOCK, table]
    with subprocess.Popen([*command, tmp_path / "calls before"], stderr=subprocess.DEVNULL) as killed:
        until_s = time.monotonic() + 240.0
        while not table.exists() or len(rows_of(table)) < 3:
            assert killed.poll() is None
            assert time.monotonic() < until_s
            time.sleep(0.02)
        killed.send_signal(signal.SIGKILL)
    done = [row["seed"] for row in rows_of(table)]
    assert 3 <= len(done) < 12
    ended = subprocess.run([*command, calls], check=True, capture_output=True, text=True)
    assert ended.stdout.strip() == f"Outcome(done={12 - len(done)}, failed=0, kept={len(done)})"
    # Each once: those that a kill has left without a row, and no other.
    assert sorted([*done, *calls.read_text().split()], key=int) == [str(seed) for seed in range(12)]
    assert sorted((row["seed"] for row in rows_of(table)), key=int) == [str(seed) for seed in range(12)]
    assert {row["steps"] for row in rows_of(table)} == {"3"}


@pytest.mark.usefixtures("cluster")
def test_a_point_that_fails_is_a_row_that_says_why_and_is_done_again_if_asked(table, tmp_path):
    mended = tmp_path / "mended"

    def fails(session, point):
        if not mended.exists():
            if point["how"] == "raises":
                raise ValueError("no such\nthing")
            if point["how"] == "ends":
                os._exit(1)
            if point["how"] == "answers":
                return {"other": 1}
        return {"steps": int(session.step().steps[-1])}

    points = sweep.grid({"scene": str(BLOCK), "level": 2, "how": ["works", "raises", "ends", "answers"]})
    points += sweep.grid({"scene": ["no-scene", str(BLOCK)], "level": 9, "how": "works"})
    assert sweep.run(table, points, fails, ["steps"]) == (1, 5, 0)
    errors = {(row["scene"], row["level"], row["how"]): row["error"] for row in rows_of(table)}
    assert errors[str(BLOCK), "2", "works"] == ""
    assert errors[str(BLOCK), "2", "raises"] == "ValueError: no such thing"
    assert errors[str(BLOCK), "2", "ends"].startswith("LostError: ")
    assert "other" in errors[str(BLOCK), "2", "answers"]
    assert errors["no-scene", "9", "works"].startswith("NotFoundError: ")
    assert errors[str(BLOCK), "9", "works"].startswith("InvalidArgumentError: dial: objects[0].level")
    mended.touch()
    assert sweep.run(table, points, fails, ["steps"]) == (0, 0, 6)
    assert sweep.run(table, points, fails, ["steps"], again=True) == (3, 2, 1)
    assert sum(row["error"] == "" for row in rows_of(table)) == 4
    assert len(rows_of(table)) == 6


@pytest.mark.usefixtures("cluster")
def test_points_wait_for_room_and_one_that_never_has_it_says_so(table, monkeypatch):
    def holds(session, point):
        time.sleep(0.05)
        return {"double": 2 * point["seed"], "steps": session.describe().step}

    monkeypatch.setattr(sweep, "_PATIENCE_S", 3.0)
    settings = {"session.max_sessions": 1, "session.max_memory_mib": 30}
    points = sweep.grid({"scene": str(BLOCK), "level": 2, "seed": range(8)})
    too_large = {"scene": "cuboid", "level": 0, "seed": 8}
    with kerf.LocalServer(PROGRAM, settings=settings) as server:
        assert sweep.run(table, [*points, too_large], holds, ["double", "steps"], server=server.address) == (8, 1, 0)
    rows = {int(row["seed"]): row for row in rows_of(table)}
    assert [rows[seed]["double"] for seed in range(8)] == [str(2 * seed) for seed in range(8)]
    assert "max_memory_mib" in rows[8]["error"]


def known(table, points):
    """A table as a sweep of these points would have left it, but for results."""
    columns = [
        *points[0],
        "scene_hash",
        "measure",
        *sweep.STROKE_RESULTS,
        "state_hash",
        "server_version",
        "node",
        "error",
    ]
    file = Table(table, columns)
    for point in points:
        file.add({**point, "measure": "stroke"})


def refused(table, points, **options):
    before = table.read_bytes()
    with pytest.raises(kerf.InvalidArgumentError) as error:
        sweep.run(table, points, **options)
    assert table.read_bytes() == before
    assert error.value.field in str(error.value)
    return error.value.field


def test_a_table_of_another_sweep_is_refused_by_its_column(table):
    axes = {"scene": "jelly", "level": [1, 2], "depth_m": [0.01, 0.02]}
    known(table, sweep.grid(axes))
    assert sweep.run(table, sweep.grid(axes)) == (0, 0, 4)
    assert refused(table, sweep.grid({**axes, "speed_m_per_s": 0.1})) == "speed_m_per_s"
    assert refused(table, sweep.grid({"scene": "jelly", "level": [1, 2]})) == "depth_m"
    assert refused(table, sweep.grid({**axes, "depth_m": [0.01, 0.03]})) == "depth_m"
    assert refused(table, sweep.grid(axes), results=["peak_force_n"]) == "tool_work_j"
    assert refused(table, sweep.grid(axes)[:3]) == "scene", "each value is one of the sweep's, and not all together"
    assert refused(table, sweep.grid(axes), measure=lambda *_: {}) == "measure"


def test_a_scene_file_that_has_changed_is_another_sweep(table, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(BLOCK.read_text())
    known(table, [{"scene": str(scene)}])
    assert refused(table, [{"scene": str(scene)}]) == "scene_hash"


def test_points_that_make_no_table_are_refused(table):
    table.touch()
    assert refused(table, []) == "points"
    assert refused(table, [{"level": 1}]) == "scene"
    assert refused(table, [{"scene": "jelly", "level": 1}, {"scene": "jelly"}]) == "level"
    assert refused(table, [{"scene": "jelly", "error": 1}]) == "error"
    assert refused(table, [{"scene": "jelly"}, {"scene": "jelly"}]) == "points"


def test_a_row_counts_when_it_is_whole(table):
    file = Table(table, ["a", "b"])
    file.add({"a": 0.1, "b": 'line\n"and", line'})
    whole = table.read_bytes()
    for cut in range(1, len(b"a,b\n2,3\n")):
        table.write_bytes(b"a,b\n2,3\n"[:cut])
        assert list(Table(table, ["a", "b"])) == []
        Table(table, ["a", "b"]).add({"a": 1})
        assert table.read_bytes() == b"a,b\n1,\n"
    table.write_bytes(whole + b"1,tw")
    assert list(Table(table, ["a", "b"])) == [{"a": "0.1", "b": 'line "and", line'}]
    assert table.read_bytes() == whole
    table.write_bytes(b"a scene, or what else this may be")
    with pytest.raises(kerf.InvalidArgumentError, match="column 'a'"):
        Table(table, ["a", "b"])
    assert table.read_bytes() == b"a scene, or what else this may be"
