"""Sweeps: one measurement over a table of parameters, on all nodes of a Ray cluster. `pip install kerf[ray]`.

A point is a row of parameters by their names. Some are for its session, all others for the measurement:

- `scene`, which each point has: one of the server's scenes, or a file of this machine that ends with `.toml`.
- `level`, `step_rate_hz`, `budget_ms`, `max_error`: as of `Client.create_session`.
- `scene.objects[0].material.young_modulus_pa`: a field of the scene, by the path that errors name it by.
"""

from __future__ import annotations

import hashlib
import itertools
import random
import re
import time
import tomllib
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kerf import cluster
from kerf.client import Client, read_scene
from kerf.errors import InvalidArgumentError, ResourceExhaustedError, UnavailableError
from kerf.motion import POSE_COLUMNS
from kerf.session import Session
from kerf.table import Table, Value, cell
from kerf.tool_way import forward

try:
    import tomli_w
    from tqdm import tqdm
except ImportError as error:
    raise ImportError(f"sweeps need what `pip install kerf[ray]` installs: {error}") from error

Point = Mapping[str, Value]
#: Drives a session that stands at rest by a point's parameters, and answers with results by their names.
Measure = Callable[[Session, Point], Mapping[str, Value]]
#: What the row of a point begins with: its parameters and `_OF_POINT`.
_Key = tuple[str, ...]

#: What `stroke` answers with.
STROKE_RESULTS = ("peak_force_n", "tool_work_j", "fracture_j")

#: Parameters that a session is created with, and how those begin that change its scene.
_OPTIONS, _FIELD = ("level", "step_rate_hz", "budget_ms", "max_error"), "scene."
#: Columns beside parameters and results: what else a row is known by, and what doing it has shown.
_OF_POINT, _OF_ROW = ("scene_hash", "measure"), ("state_hash", "server_version", "node", "error")
#: A server builds two scenes at a time, and all others wait for them.
_CALL_TIMEOUT_S = 600.0
#: How long a point waits for room on a server that no other point is on: somebody else may be.
_PATIENCE_S = 30.0
#: Times that a point may be lost with the process or the node that did it, before it is taken for the reason.
_MOST_LOSSES = 3


class Outcome(NamedTuple):
    """What a sweep has done."""

    #: Points that were done without an error.
    done: int
    #: Points that failed; their rows say why.
    failed: int
    #: Points that the table had before.
    kept: int


def grid(axes: Mapping[str, Value | Iterable[Value]]) -> list[dict[str, Value]]:
    """A point for each combination of values; a single value is the same in all of them."""
    values = [[axis] if isinstance(axis, str | int | float) else list(axis) for axis in axes.values()]
    return [dict(zip(axes, combination, strict=True)) for combination in itertools.product(*values)]


def stroke(session: Session, point: Point) -> dict[str, Value]:
    """Moves a tool straight along the way it cuts, by `depth_m` at `speed_m_per_s`.

    It starts at `x_m`, `y_m`, `z_m`, turned by the quaternion `qx`, `qy`, `qz`, `qw`; unturned without one. `tool` is
    its name or index, 0 unless it is given.
    """
    needed = {"x_m", "y_m", "z_m", "depth_m", "speed_m_per_s"}
    known = needed | {"scene", "tool", *POSE_COLUMNS, *_OPTIONS}
    for name in sorted(needed - point.keys()):
        raise InvalidArgumentError(f"{name}: a stroke needs it", field=name, limit=", ".join(sorted(needed)))
    for name in sorted(name for name in point.keys() - known if not name.startswith(_FIELD)):
        raise InvalidArgumentError(f"{name}: a stroke has none", field=name, limit=", ".join(sorted(known)))
    given = {"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0, "tool": 0, **point}
    start = np.array([float(given[column]) for column in POSE_COLUMNS])
    end, depth_m = start.copy(), float(given["depth_m"])
    end[:3] += depth_m * forward(start[None, 3:])[0]
    tool = given["tool"] if isinstance(given["tool"], str) else int(given["tool"])
    result = session.drive([0.0, depth_m / float(given["speed_m_per_s"])], [start, end], tool=tool)
    return {
        "peak_force_n": float(np.linalg.norm(result.force_n[:, session.tool_index(tool)], axis=1).max()),
        "tool_work_j": result.energy.tool_work_j,
        "fracture_j": result.energy.fracture_j,
    }


def run(
    table: str | Path,
    points: Iterable[Point],
    measure: Measure = stroke,
    results: Sequence[str] = STROKE_RESULTS,
    *,
    server: str | None = None,
    settings: Mapping[str, object] | None = None,
    again: bool = False,
) -> Outcome:
    """Does the points that the table lacks, and adds the row of each as it is done.

    A node does as many points at a time as it has CPUs, and fewer where its server refuses more: those are done later.
    A point that fails is a row with an error.

    Args:
        table: A CSV file; a new one if it is not there. One sweep at a time writes it.
        points: All have the same parameters, and none is there twice.
        measure: What to do at each point. The table knows it by its name: give it another when you change it.
        results: Names of what it answers with.
        server: Where a node finds a server, as seen from the node. Without it each node starts one of its own: the
            program that `KERF_SERVER_PROGRAM` names there, or `kerf-server` on the path.
        settings: Of servers that are started, as of `LocalServer`.
        again: Do points anew that have failed before.

    Raises:
        InvalidArgumentError: The points are not of one table, or the table is of another sweep; it names the column.
        UnavailableError: The cluster has no node with a CPU.
    """
    given = [{name: _plain(value) for name, value in point.items()} for point in points]
    if not given:
        raise InvalidArgumentError("points: there are none", field="points", limit="one or more")
    columns = [*given[0], *_OF_POINT]
    _check_points(given, [*columns, *results, *_OF_ROW])
    job = _Job.of(given, measure, results)
    wanted = {job.key(point, given[0]): point for point in given}
    if len(wanted) < len(given):
        raise InvalidArgumentError("points: one is there twice", field="points", limit="each once")
    rows = Table(Path(table), [*columns, *results, *_OF_ROW])
    _check_rows(rows, columns, wanted)
    if again:
        rows.remove([row for row in rows if row["error"]])
    known = {tuple(row[column] for column in columns) for row in rows}
    missing = {key: point for key, point in wanted.items() if key not in known}
    failed = 0
    with tqdm(total=len(wanted), initial=len(known), unit="point", disable=None) as bar:
        for key, found in _found(job, missing, server, settings or {}):
            rows.add({**dict(zip(columns, key, strict=True)), **found})
            failed += "error" in found
            bar.set_postfix(failed=failed, refresh=False)
            bar.update()
    return Outcome(len(missing) - failed, failed, len(known))


def _check_points(points: Sequence[Point], columns: Sequence[str]) -> None:
    """Refuses points that do not make a table."""
    for point in points:
        for name in sorted(point.keys() ^ {"scene", *points[0]}):
            raise InvalidArgumentError(f"{name}: not every point has it", field=name, limit="in each point")
    for name, count in Counter(columns).items():
        if count > 1:
            raise InvalidArgumentError(f"{name}: {count} columns have this name", field=name, limit="one column")


def _check_rows(rows: Table, columns: Sequence[str], wanted: Iterable[_Key]) -> None:
    """Refuses a table with a row that is no point of the sweep."""
    keys = set(wanted)
    known = {column: {key[at] for key in keys} for at, column in enumerate(columns)}
    for row in rows:
        if tuple(row[column] for column in columns) in keys:
            continue
        strange = [column for column in columns if row[column] not in known[column]]
        # Where each value is one of the sweep's, it is all of them together that no point has.
        named = ", ".join(f"column {column!r} with {row[column]!r}" for column in strange[:1] or columns)
        words = f"{rows.path}: it has a row of another sweep: {named}"
        raise InvalidArgumentError(words, field=(strange or columns)[0], limit="rows of this sweep")


class _SceneFile(NamedTuple):
    """The text of a scene file, the files that it names, and a hash of all."""

    toml: str
    files: Mapping[str, bytes]
    hash: str

    @staticmethod
    def read(path: str) -> _SceneFile:
        toml, files = read_scene(path)
        whole = hashlib.sha256(toml.encode())
        for name, data in sorted(files.items()):
            whole.update(f"{name} {len(data)}".encode() + data)
        return _SceneFile(toml, files, whole.hexdigest()[:16])


@dataclass(frozen=True)
class _Job:
    """What all points have in common."""

    measure: Measure
    results: frozenset[str]
    #: By the names that points have for them.
    scenes: Mapping[str, _SceneFile]

    @staticmethod
    def of(points: Iterable[Point], measure: Measure, results: Iterable[str]) -> _Job:
        """Reads the scene files of the points."""
        names = {str(point["scene"]) for point in points}
        scenes = {name: _SceneFile.read(name) for name in names if name.endswith(".toml")}
        return _Job(measure, frozenset(results), scenes)

    def key(self, point: Point, parameters: Iterable[str]) -> _Key:
        """What the point's row begins with."""
        scene = self.scenes.get(str(point["scene"]))
        measure = getattr(self.measure, "__qualname__", type(self.measure).__qualname__)
        return *(cell(point[name]) for name in parameters), "" if scene is None else scene.hash, cell(measure)

    def create(self, client: Client, point: Point) -> Session:
        """A session of the point's scene."""
        name = str(point["scene"])
        options: dict[str, Any] = {option: point[option] for option in _OPTIONS if option in point}
        changes = {column: value for column, value in point.items() if column.startswith(_FIELD)}
        if name in self.scenes:
            toml, files, _ = self.scenes[name]
            return client.create_session(toml=_changed(toml, changes), files=files, **options)
        if changes:
            return client.create_session(toml=_changed(client.scene_toml(name), changes), **options)
        return client.create_session(name, **options)


class _Refusal(NamedTuple):
    """The server has no room now; its words."""

    words: str


def _found(
    job: _Job, missing: Mapping[_Key, Point], server: str | None, settings: Mapping[str, object]
) -> Iterator[tuple[_Key, dict[str, Value]]]:
    """Does points on all nodes; what was found at each, as it comes."""
    if not missing:
        return
    cluster.connect()
    shared = cluster.shared(job)
    servers: dict[str, cluster.NodeServer] = {}
    waiting, losses = deque(missing), Counter[_Key]()
    running: dict[cluster.Answer[dict[str, Value] | _Refusal], tuple[str, _Key, float]] = {}
    #: Nodes whose servers have refused a point, until another that is on them has ended.
    full: set[str] = set()
    try:
        while waiting or running:
            while waiting and (node := _freest(Counter(on for on, *_ in running.values()), full)):
                if node not in servers:
                    servers[node] = cluster.NodeServer(node, server, settings)
                key = waiting.popleft()
                patience_s = 0.0 if any(on == node for on, *_ in running.values()) else _PATIENCE_S
                answer = cluster.start(node, _measured, shared, missing[key], node, servers[node], patience_s)
                running[answer] = node, key, patience_s
            if not running:
                raise UnavailableError("the cluster has no node with a CPU")
            answer = cluster.Answer.first(running)
            node, key, patience_s = running.pop(answer)
            full.discard(node)
            try:
                found = answer.get()
            except cluster.LostError as error:
                losses[key] += 1
                if losses[key] < _MOST_LOSSES:
                    waiting.append(key)
                    continue
                found = {"node": node, "error": f"LostError: {error}"}
            if isinstance(found, _Refusal):
                is_alone = all(on != node for on, *_ in running.values())
                if not is_alone:
                    full.add(node)
                if not is_alone or patience_s == 0.0:
                    waiting.append(key)
                    continue
                found = {"node": node, "error": f"ResourceExhaustedError: {found.words}"}
            yield key, found
    finally:
        for answer in running:
            answer.cancel()
        for one in servers.values():
            one.stop()


def _freest(busy: Counter[str], full: set[str]) -> str | None:
    """The node with most CPUs that no point is on, if there is one."""
    free = {node: cpus - busy[node] for node, cpus in cluster.nodes().items() if node not in full}
    node = max(free, key=lambda node: free[node], default=None)
    return node if node is not None and free[node] > 0 else None


def _measured(
    job: _Job, point: Point, node: str, server: cluster.NodeServer, patience_s: float
) -> dict[str, Value] | _Refusal:
    """What is found at a point, in a process on a node."""
    found: dict[str, Value] = {"node": node}
    try:
        with Client(server.address(), timeout_s=_CALL_TIMEOUT_S) as client:
            found["server_version"] = client.server_version()
            session = _admitted(lambda: job.create(client, point), patience_s)
            if isinstance(session, _Refusal):
                return session
            with session:
                results = job.measure(session, point)
                if results.keys() != job.results:
                    limit = ", ".join(sorted(job.results))
                    words = f"results: {', '.join(sorted(results))}, and not {limit}"
                    raise InvalidArgumentError(words, field="results", limit=limit)
                found["state_hash"] = f"{session.describe().state_hash:016x}"
                found |= {name: _plain(value) for name, value in results.items()}
    except Exception as error:
        # Whatever a measurement fails with is what its row has to say.
        found["error"] = f"{type(error).__name__}: {error}"
    return found


def _admitted(create: Callable[[], Session], patience_s: float) -> Session | _Refusal:
    """A session, as soon as the server has room for it."""
    until_s, wait_s = time.monotonic() + patience_s, 0.1
    while True:
        try:
            return create()
        except ResourceExhaustedError as error:
            # A scene that takes too long to build does so later, too.
            if error.limit == "max_setup_s":
                raise
            if time.monotonic() + wait_s > until_s:
                return _Refusal(str(error))
        # By chance, so that those who wait together do not come back together.
        time.sleep(random.uniform(0.5, 1.0) * wait_s)
        wait_s = min(2.0 * wait_s, 2.0)


def _changed(toml: str, changes: Mapping[str, Value]) -> str:
    """The text of a scene with fields changed, or added where they had their default."""
    if not changes:
        return toml
    scene = tomllib.loads(toml)
    for column, value in changes.items():
        *path, last = [int(part) if part.isdigit() else part for part in re.findall(r"[^.\[\]]+", column)[1:]]
        inside: Any = scene
        try:
            for part in path:
                inside = inside[part]
            inside[last] = value
        except (KeyError, IndexError, TypeError) as error:
            raise InvalidArgumentError(
                f"{column}: the scene has no such table", field=column, limit="a table"
            ) from error
    return tomli_w.dumps(scene)


def _plain(value: Any) -> Value:  # noqa: ANN401
    """A value of NumPy as Python's, as protocol and tables take them."""
    plain: Value = value.item() if isinstance(value, np.generic) else value
    return plain
