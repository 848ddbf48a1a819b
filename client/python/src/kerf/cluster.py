"""Nodes of a Ray cluster, each with a server of its own; the one place that knows Ray. `pip install kerf[ray]`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Generic, TypeVar

from kerf.errors import KerfError
from kerf.local_server import LocalServer

try:
    import ray
    from ray.exceptions import RayError, RayTaskError
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy
except ImportError as error:
    raise ImportError(f"this needs what `pip install kerf[ray]` installs: {error}") from error

T = TypeVar("T")


class LostError(KerfError):
    """A process of the cluster ended before it had answered, or its node did."""


class Answer(Generic[T]):
    """What another process is about to answer."""

    def __init__(self, reference: Any) -> None:  # noqa: ANN401
        self._reference = reference

    def get(self) -> T:
        """Waits for it, and raises what the other process raised.

        Raises:
            LostError: Nobody is left to answer.
        """
        try:
            answer: T = ray.get(self._reference)
        except RayTaskError:
            # It is of the class of what was raised, too.
            raise
        except RayError as error:
            raise LostError(str(error)) from error
        return answer

    def cancel(self) -> None:
        """Interrupts whoever works on it."""
        ray.cancel(self._reference)

    @staticmethod
    def first(answers: Iterable[Answer[T]]) -> Answer[T]:
        """Waits until one of them is there."""
        by_reference = {answer._reference: answer for answer in answers}
        ready, _ = ray.wait(list(by_reference), num_returns=1)
        return by_reference[ready[0]]


class Actor:
    """An object in a process of its own on a node; it ends with this program at the latest."""

    def __init__(self, node: str, kind: type, *arguments: object) -> None:
        # It waits for a server most of the time, whose steps are what takes a CPU.
        self._handle = ray.remote(kind).options(num_cpus=0, **_on(node)).remote(*arguments)

    def ask(self, method: str, *arguments: object) -> Answer[Any]:
        """Calls a method of it."""
        return Answer(getattr(self._handle, method).remote(*arguments))

    def stop(self) -> None:
        """Ends its process, and those that it has started."""
        ray.kill(self._handle)


class NodeServer:
    """The server of a node: one with an address as seen from there, or one that is started when it is asked for."""

    def __init__(self, node: str, address: str | None, settings: Mapping[str, object]) -> None:
        self._address = address or ""
        self._starter = None if address else Actor(node, _Starter, dict(settings))

    def address(self) -> str:
        """Host and port, as seen from the node."""
        return self._address if self._starter is None else self._starter.ask("address").get()

    def stop(self) -> None:
        """Ends a server that was started."""
        if self._starter is not None:
            self._starter.stop()


class _Starter:
    """Runs a server for the processes of its node."""

    def __init__(self, settings: Mapping[str, object]) -> None:
        self._settings = settings
        self._server: LocalServer | None = None

    def address(self) -> str:
        """Starts it, also after it has ended by itself: one scene that was too much is not the end of all."""
        if self._server is None or not self._server.is_running:
            self._server = LocalServer.of_environment(self._settings)
        return self._server.address


def connect() -> None:
    """Joins the cluster of `RAY_ADDRESS` or of this machine; without one this machine becomes one."""
    if not ray.is_initialized():
        ray.init()


def nodes() -> dict[str, int]:
    """The nodes that take work, by their ids, and how many CPUs each has."""
    cpus = {str(node["NodeID"]): int(node["Resources"].get("CPU", 0)) for node in ray.nodes() if node["Alive"]}
    return {node: count for node, count in cpus.items() if count > 0}


def start(node: str, function: Callable[..., T], *arguments: object) -> Answer[T]:
    """Calls a function in a process on a node, with one of its CPUs, once."""
    return Answer(ray.remote(function).options(num_cpus=1, max_retries=0, **_on(node)).remote(*arguments))


def shared(value: T) -> T:
    """What many calls are given, to be sent to each node once."""
    reference: T = ray.put(value)
    return reference


def _on(node: str) -> dict[str, object]:
    return {"scheduling_strategy": NodeAffinitySchedulingStrategy(node, soft=False)}
