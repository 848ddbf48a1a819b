"""Builds another commit and runs it and this one in turn, on the same scenes: `run.py COMMIT [ROUNDS]` writes
docs/explanation/compared.md."""

import csv
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILT, OUT = ROOT / "target/compare", ROOT / "out/compare"
PAGE = ROOT / "docs/explanation/compared.md"
ADDRESS = "127.0.0.1:50164"
# Of a stroke of `simulate`, s.
STROKE_S = 1.2
RATES_HZ = [1000, 500, 250]
# The liver's voxels are 3.5 mm; with these there are 1.9 million, whose elements carry three quarters of its fracture energy.
FINE = {"voxel_size_m = 0.0035": "voxel_size_m = 0.00088",
        "fracture_energy_j_per_m2 = 2000.0": "fracture_energy_j_per_m2 = 1500.0"}
# Between as many links parted, and from as many on, steps of a dicing are compared.
FEW, MANY = range(300, 701), 2400
# A step that takes less had no tool in the tissue, ms.
IDLE_MS = 0.2
# That many livers at a rate that leaves room for each.
SESSIONS, SESSION_HZ = 3, 60
# Within this time an allocator has given back what the making of a session let go of, s.
SETTLED_S = 15


class Version:
    """A commit's programs."""

    def __init__(self, folder):
        self.server, self.client = folder / "kerf-server", folder / "kerf-load"

    def simulate(self, *options):
        """Each step's time, ms, and parted links; the summary; the greatest memory, bytes."""
        # A run with more steps is not replaced.
        shutil.rmtree(OUT / "run", ignore_errors=True)
        command = [str(part) for part in (self.server, "simulate", *options, "--out", OUT / "run")]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            sys.exit(f"{' '.join(command)} failed")
        with open(OUT / "run/profile.csv", newline="") as profile:
            steps = [(int(row["total_ns"]) * 1e-6, int(row["parted_links"])) for row in csv.DictReader(profile)]
        return steps, json.loads((OUT / "run/summary.json").read_text()), usage.ru_maxrss * 1024

    def serve(self, use):
        server = subprocess.Popen([self.server, "serve", "--listen", ADDRESS, "--log-filter", "error"],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            return use(server)
        finally:
            server.terminate()
            server.wait()

    def load(self, *options):
        command = [self.client, "--server", f"http://{ADDRESS}", "--wait-for-server", 10, "--scene", "liver", "--progress",
                   "off", "--out", OUT / "load", *options]
        # What it complains of is seen.
        return subprocess.run([str(part) for part in command], check=True, stdout=subprocess.PIPE, text=True).stdout

    def session_bytes(self):
        """What each liver adds to a server's memory."""
        def grown(server):
            def resident():
                time.sleep(SETTLED_S)
                status = pathlib.Path(f"/proc/{server.pid}/status").read_text()
                return 1024 * int(re.search(r"VmRSS:\s+(\d+)", status)[1])
            def add_session():
                self.load("--keep-session", "--step-rates", SESSION_HZ, "--strokes", 1, "--jitter", 0, "--duration", 1)
            add_session()
            first = resident()
            for _ in range(SESSIONS - 1):
                add_session()
            return (resident() - first) / (SESSIONS - 1)
        return self.serve(grown)

    def figures(self):
        """One run of everything: (what, unit) to a figure."""
        _, summary, coarse_bytes = self.simulate("liver", "--rate", 1000, "--threads", 1, "--duration", STROKE_S)
        coarse_voxels, found = summary["voxels"], {
            "1 kHz, one thread, without fracture: median": summary["step_ms_median_without_fracture"],
            "the same: 99th percentile of all steps": summary["step_ms_p99"],
            "the same, with fracture: median": summary["step_ms_median_with_fracture"],
        }
        _, summary, _ = self.simulate("liver", "--rate", 60, "--threads", 2, "--level", 0, "--duration", STROKE_S)
        found["60 Hz, level 0, two threads: median"] = summary["step_ms_median_without_fracture"]
        _, summary, fine_bytes = self.simulate(OUT / "fine.toml", "--rate", 60, "--threads", 2, "--duration", STROKE_S)
        found["60 Hz, 1.9 million voxels, two threads: median"] = summary["step_ms_median_without_fracture"]
        steps, _, _ = self.simulate("liver", "--rate", 250, "--threads", 1, "--script", OUT / "dicing.csv")
        few, many, links = [], [], 0
        for time_ms, parted in steps:
            links += parted
            if time_ms > IDLE_MS:
                (few if links in FEW else many if links >= MANY else []).append(time_ms)
        found["diced at 250 Hz, one thread, 2,400 links and more parted: median"] = statistics.median(many)
        found["the same, over that at 300 to 700 links"] = statistics.median(many) / statistics.median(few)
        for rate_hz in RATES_HZ:
            told = self.serve(lambda _: self.load("--step-rates", rate_hz, "--strokes", 2, "--jitter", 0, "--depth", 0.05,
                                                  "--speed", 0.05))
            found[f"served at {rate_hz} Hz: late steps, %"] = float(re.search(r"late \(([0-9.]+) %\)", told)[1])
        found["memory of a session, MB"] = self.session_bytes() / 1e6
        found["memory of a voxel, bytes"] = (fine_bytes - coarse_bytes) / (summary["voxels"] - coarse_voxels)
        return found


def run(*command, **options):
    subprocess.run([str(part) for part in command], check=True, **options)


def resolved(name, how="--short"):
    """The hash of what this repository has by that name."""
    return subprocess.run(["git", "rev-parse", how, name], check=True, capture_output=True, text=True, cwd=ROOT).stdout.strip()


def build(commit):
    """Both versions' programs, the other commit's in a clone of its own."""
    tree = BUILT / "tree"
    if not tree.exists():
        run("git", "clone", "--quiet", "--shared", "--no-checkout", ROOT, tree)
    run("git", "fetch", "--quiet", "origin", cwd=tree)
    run("git", "checkout", "--quiet", "--detach", resolved(commit, "--verify"), cwd=tree)
    run("cargo", "build", "--release", "-p", "kerf-server", "-p", "kerf-load", "--target-dir", BUILT / "build", cwd=tree)
    run("cargo", "build", "--release", "-p", "kerf-server", "-p", "kerf-load", cwd=ROOT)
    return Version(BUILT / "build/release"), Version(ROOT / "target/release")


def write_scenes():
    """The fine liver, and twenty plunges through the coarse one: ten along z, ten along x."""
    OUT.mkdir(parents=True, exist_ok=True)
    scene = (ROOT / "server/scenes/builtin/liver.toml").read_text()
    for there, fine in FINE.items():
        scene = scene.replace(there, fine)
    (OUT / "fine.toml").write_text(scene)
    at, lines, half = 0.002, ["time_s,tool,x_m,y_m,z_m,qx,qy,qz,qw"], 0.5**0.5
    for n in range(20):
        along_x, across = n >= 10, -0.05 + 0.1 * (n % 5) / 4
        along = (-0.06 if n % 10 < 5 else 0.0)
        x, z = (along, across) if along_x else (across, along)
        turn = f"0,{half},0,{half}" if along_x else "0,0,0,1"
        for after_s, y_m in ((0.0, 0.165), (0.6, 0.0), (0.75, 0.165)):
            lines.append(f"{at + after_s:.3f},blade,{x},{y_m},{z},{turn}")
        lines.append(f"{at + 0.752:.3f},blade,lift,,,,,,")
        at += 0.77
    (OUT / "dicing.csv").write_text("\n".join(lines) + "\n")


def cell(value):
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def main():
    commit, rounds = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 5
    versions = build(commit)
    write_scenes()
    runs = [[], []]
    for _ in range(rounds):
        for of, version in zip(runs, versions):
            of.append(version.figures())
            print(json.dumps(of[-1]), flush=True)
    lines = []
    for what in runs[0][0]:
        before, after = ([of[what] for of in each] for each in runs)
        ratio = statistics.median(a / b if b else float("nan") for a, b in zip(after, before))
        lines.append(f"| {what} | {cell(statistics.median(before))} | {cell(statistics.median(after))} | {ratio:.2f} |\n")
    here, there = resolved("HEAD"), resolved(commit)
    model = next(line for line in open("/proc/cpuinfo") if line.startswith("model name")).split(":")[1].strip()
    PAGE.write_text(HEAD.format(commit=commit, rounds=rounds, here=here, there=there, sessions=SESSIONS, stroke_s=STROKE_S,
                                machine=f"{model}, {os.cpu_count()} cores")
                    + "".join(lines))
    print(PAGE.read_text())


HEAD = """# Compared with an earlier version

Written by `make compare BASE={commit}`, which builds that commit and runs both in turn, {rounds} times, with nothing else
on the machine: {machine}. The scene is `liver`. A figure is the median of its runs, in ms where no unit is said; the
ratio is the median over pairs of runs of this version ({here}) over the other ({there}).

Steps are those of the first {stroke_s} s of `simulate`'s stroke, straight down at 0.1 m/s, and of a dicing by twenty plunges, ten along
z and ten along x. Of the 1.9 million voxels each has 0.88 mm; their elements bear three quarters of the liver's fracture energy. Late
steps are those of the demo's strokes with one viewer. A session's memory is what each of {sessions} livers adds to a server's, after a
short stroke. A voxel's is what the run of the fine liver takes at most beyond that of the coarse one.

| what | {there} | {here} | ratio |
|---|---|---|---|
"""

main()
