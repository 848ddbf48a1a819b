"""What a step costs from Python: one a call, a hundred a call, and with a surface after each.

Run it with `--program PATH/kerf-server --scene jelly`.
"""

import argparse
import statistics
import time
from collections.abc import Callable

import kerf

STEPS = 1000


def microseconds_a_step(take: Callable[[], object], steps: int) -> float:
    """Median over the calls that it takes to make `STEPS` steps, `steps` a call."""
    took_s = []
    for _ in range(STEPS // steps):
        begin_s = time.perf_counter()
        take()
        took_s.append(time.perf_counter() - begin_s)
    return statistics.median(took_s) * 1e6 / steps


def create(client: kerf.Client, scene: str) -> kerf.Session:
    """A session of a file, or of a scene that the server knows."""
    return client.create_session(path=scene) if scene.endswith(".toml") else client.create_session(scene)


def main() -> None:
    """Measures and prints."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--program", default="kerf-server", help="the server to start")
    arguments.add_argument("--scene", default="jelly", help="a built-in scene, or a scene file")
    given = arguments.parse_args()
    with (
        kerf.LocalServer(given.program) as server,
        server.client() as client,
        create(client, given.scene) as session,
    ):
        session.step(1000)
        print(f"100 steps a call: {microseconds_a_step(lambda: session.step(100), 100):.0f} us a step")
        print(f"1 step a call: {microseconds_a_step(session.step, 1):.0f} us a step")
        with session.view() as view:

            def look() -> None:
                view.surfaces(step=int(session.step().steps[-1]))

            print(f"1 step a call and the surface after it: {microseconds_a_step(look, 1):.0f} us a step")


if __name__ == "__main__":
    main()
