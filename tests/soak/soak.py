"""Runs a server for hours as many hands would, and says whether what it takes of the machine grows.

Eight clients make sessions, cut, watch, stall, reset, save and restore, leave without a word and come back, each by a
seed of its own. In the first part of the time the server is killed now and then and started anew with its journals:
every session that was there has to be there again. From then on it lives, and its memory, descriptors and threads are
measured.
"""

from __future__ import annotations

import argparse
import csv
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import kerf

CLIENTS = 8
SCENES = ["cuboid", "jelly", "liver"]
# Slow enough for eight sessions on two cores.
RATE_HZ = 20.0
# Of the time: the server is killed in it.
KILLS = 0.25
SAMPLE_S = 2.0
# What each may grow by between the first and the last quarter of the server's last life, over what it was.
MOST_GROWTH = 0.05
# So many samples of a number of sessions make a median.
FEWEST = 3
# Idle connections and caches come and go: so many descriptors and threads may be left when all clients have gone.
MOST_LEFT = 4


@dataclass
class Server:
    """A server with journals, which may be killed."""

    program: Path
    folder: Path
    port: int
    process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        """Where clients reach it."""
        return f"127.0.0.1:{self.port}"

    def start(self) -> None:
        """Starts it, and waits until it listens."""
        command = [self.program, "serve", "--listen", self.address, "--log-filter", "error"]
        settings = ["session.max_sessions=32", "session.max_load=64", "session.idle_timeout_s=20"]
        for setting in [f"journal_dir={self.folder}", *settings]:
            command += ["--set", setting]
        self.process = subprocess.Popen([str(part) for part in command])
        with kerf.Client(self.address) as client:
            client.wait_until_ready(30.0)

    def kill(self) -> None:
        """Kills it where it stands."""
        assert self.process is not None
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def takes(self) -> dict[str, int]:
        """Memory in KiB, descriptors and threads."""
        assert self.process is not None
        proc = Path("/proc") / str(self.process.pid)
        status = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
        memory_kib = int(status["VmRSS"].split()[0])
        return {
            "memory_kib": memory_kib,
            "descriptors": len(list((proc / "fd").iterdir())),
            "threads": int(status["Threads"]),
        }


@dataclass
class Soak:
    """What the clients do, and what came of it."""

    server: Server
    ends_at: float
    lock: threading.Lock = field(default_factory=threading.Lock)
    done: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    # Sessions that have been there for long enough to be on the disk.
    alive: dict[str, float] = field(default_factory=dict)
    # Until all sessions were back after a kill, at most.
    slowest_back_s: float = 0.0

    def note(self, what: str) -> None:
        """One more of these is done."""
        with self.lock:
            self.done[what] += 1

    def client(self, seed: int) -> None:
        """One after the other what its seed says, until the time is over."""
        choose = random.Random(seed)
        while time.monotonic() < self.ends_at:
            try:
                with kerf.Client(self.server.address) as client:
                    self.session(client, choose)
            except kerf.KerfError as error:
                # Killed, full, or somebody else's doing: words that people may read.
                with self.lock:
                    self.refused[type(error).__name__] += 1
                time.sleep(0.5)
            except Exception as error:
                with self.lock:
                    self.wrong.append(f"seed {seed}: {error!r}")
                return

    def session(self, client: kerf.Client, choose: random.Random) -> None:
        """Joins a session or makes one, does something with it, and closes it or leaves it to others."""
        known = list(self.alive)
        if known and choose.random() < 0.3:
            self.live(client.join_session(choose.choice(known)), choose)
            return
        session = client.create_session(choose.choice(SCENES), real_time=True, step_rate_hz=RATE_HZ)
        self.note("created")
        with self.lock:
            self.alive[session.id] = time.monotonic()
        self.live(session, choose)
        if choose.random() < 0.8:
            with self.lock:
                self.alive.pop(session.id, None)
            session.close()
            self.note("closed")

    def live(self, session: kerf.Session, choose: random.Random) -> None:
        """A few things one after the other."""
        for _ in range(choose.randrange(1, 6)):
            if time.monotonic() > self.ends_at:
                return
            what = choose.choice([self.cut, self.cut, self.watch, self.reset, self.saves, self.stall, self.vanish])
            what(session, choose)
            self.note(what.__name__)

    def cut(self, session: kerf.Session, choose: random.Random) -> None:
        """Takes a blade down, anywhere and as far as it goes, while somebody watches."""
        x, z = choose.uniform(-0.02, 0.02), choose.uniform(-0.02, 0.02)
        ways = np.linspace(0.1, choose.uniform(-0.02, 0.05), 20)
        poses = np.array([[x, y, z, 0.0, 0.0, 0.0, 1.0] for y in ways])
        with session.view(), session.control() as control:
            control.play(np.linspace(0.0, choose.uniform(0.5, 2.0), len(poses)), poses)

    def watch(self, session: kerf.Session, choose: random.Random) -> None:
        """Looks on, at any rate."""
        with session.view(choose.uniform(1.0, 60.0)) as view:
            view.surfaces()
            time.sleep(choose.uniform(0.0, 2.0))

    def reset(self, session: kerf.Session, _: random.Random) -> None:
        """Back to rest."""
        session.reset()

    def saves(self, session: kerf.Session, choose: random.Random) -> None:
        """Saves a state, goes back to it, and may forget it."""
        name = choose.choice("abc")
        session.save_checkpoint(name)
        session.restore_checkpoint(name)
        if choose.random() < 0.5:
            session.delete_checkpoint(name)

    def stall(self, session: kerf.Session, choose: random.Random) -> None:
        """Takes the tools and says nothing."""
        with session.control():
            time.sleep(choose.uniform(0.0, 3.0))

    def vanish(self, session: kerf.Session, _: random.Random) -> None:
        """Opens streams and never ends them: their connection is cut."""
        with kerf.Client(self.server.address) as other:
            joined = other.join_session(session.id)
            joined.view()
            joined.control()

    def kill(self) -> None:
        """Kills the server, starts it anew, and asks for the sessions that were there."""
        with self.lock:
            old = time.monotonic() - 1.0
            before = [session for session, since in self.alive.items() if since < old]
        with kerf.Client(self.server.address) as client:
            there = set(client.sessions())
        self.server.kill()
        self.server.start()
        began = time.monotonic()
        lost = [session for session in before if session in there]
        with kerf.Client(self.server.address) as client:
            # Each is back as soon as it is restored; none is lost as long as some are still to come.
            are_expected = True
            while lost and are_expected:
                time.sleep(0.05)
                are_expected = client.expected_sessions() > 0
                back = set(client.sessions())
                with self.lock:
                    lost = [session for session in lost if session not in back and session in self.alive]
        if lost:
            self.wrong.append(f"a kill lost {lost}")
        self.slowest_back_s = max(self.slowest_back_s, time.monotonic() - began)
        self.note("killed")


def quarter(samples: list[dict[str, float]], which: int, what: str) -> dict[float, float]:
    """Medians over a quarter of the samples, by how many sessions there were: each takes its part."""
    size = len(samples) // 4
    by_sessions: dict[float, list[float]] = defaultdict(list)
    for sample in samples[which * size : (which + 1) * size]:
        by_sessions[sample["sessions"]].append(sample[what])
    return {sessions: float(np.median(of)) for sessions, of in by_sessions.items() if len(of) >= FEWEST}


def main() -> int:
    """Ends with 1 where something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", type=Path, default=Path("target/release/kerf-server"))
    parser.add_argument("--out", type=Path, default=Path("out/soak.csv"))
    options = parser.parse_args()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        server = Server(options.program, Path(folder), port)
        server.start()
        begin = time.monotonic()
        soak = Soak(server, begin + 60.0 * options.minutes)
        threads = [threading.Thread(target=soak.client, args=(options.seed * 1000 + n,)) for n in range(CLIENTS)]
        for thread in threads:
            thread.start()
        calm_from = begin + 60.0 * options.minutes * KILLS
        next_kill = random.Random(options.seed)
        while time.monotonic() < calm_from:
            time.sleep(min(next_kill.uniform(5.0, 30.0), max(calm_from - time.monotonic(), 0.0)))
            soak.kill()
        samples: list[dict[str, float]] = []
        while time.monotonic() < soak.ends_at:
            time.sleep(SAMPLE_S)
            with kerf.Client(server.address) as client:
                sessions = len(client.sessions())
            samples.append({"time_s": time.monotonic() - begin, "sessions": sessions, **server.takes()})
        for thread in threads:
            thread.join()

        # Sessions that nobody uses end by themselves, and their journals go after them.
        def journals() -> list[str]:
            return [path.name for path in Path(folder).iterdir() if path.suffix == ".mcap"]

        with kerf.Client(server.address) as client:
            deadline = time.monotonic() + 60.0
            while (client.sessions() or journals()) and time.monotonic() < deadline:
                time.sleep(1.0)
            left_sessions = len(client.sessions())
        left = server.takes()
        left_journals = journals()
        server.kill()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("w", newline="") as file:
        table = csv.DictWriter(file, samples[0])
        table.writeheader()
        table.writerows(samples)
    print(f"done: {dict(soak.done)}; refused: {dict(soak.refused)}")
    print(f"all sessions were back {soak.slowest_back_s:.1f} s after a kill at most")
    wrong = soak.wrong
    for what in ("memory_kib", "descriptors", "threads"):
        first, last = quarter(samples, 0, what), quarter(samples, 3, what)
        both = sorted(first.keys() & last.keys())
        if not both:
            wrong.append(f"{what}: the first and the last quarter never had as many sessions; run it for longer")
            continue
        was, became = (float(np.mean([of[sessions] for sessions in both])) for of in (first, last))
        words = f"{was:.0f} in the first quarter, {became:.0f} in the last with as many sessions"
        print(f"{what}: {words}, {left[what]} without clients")
        if became > was * (1.0 + MOST_GROWTH) + MOST_LEFT:
            wrong.append(f"{what} grows from {was:.0f} to {became:.0f}")
    if left_sessions or left_journals:
        wrong.append(f"{left_sessions} sessions and the journals {left_journals} are left of nobody")
    for words in wrong:
        print(f"WRONG: {words}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
