"""Steps the same soft block in MuJoCo, in Rapier and here, one thread each, in turn, and writes docs/explanation/peers.md."""

import csv
import json
import pathlib
import statistics
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
SERVER, RAPIER = ROOT / "target/release/kerf-server", ROOT / "target/peers/release/rapier-peer"
ROUNDS = 3
HEAD = """# Peers

Written by `make peers`, which installs MuJoCo with pip and builds Rapier. A cube of 90 mm, 1000 nodes, E 1.5 MPa,
nu 0.4, is fixed at its lowest nodes and settles under its weight for 0.5 s, on one thread. A figure is the median over
{rounds} runs, taken in turn, of the median step of each. Linear systems are solved to a relative residual of 1e-3 in each.
The sag of the top shows whether the step was solved: at rest it is 0.023 mm, less than the {free:.4f} mm of a block that may
widen at its foot. Peers have tetrahedra on the same nodes; ours are hexahedra. Neither peer cuts by energy, and no
blade is in this scene: it compares the elastic step alone.

| program | rate, Hz | elements | step, ms | over ours | sag, mm |
|---|---|---|---|---|---|
"""


def output(*command):
    return subprocess.run([str(part) for part in command], check=True, capture_output=True, text=True,
                          cwd=ROOT / "target/peers").stdout


def ours(rate_hz):
    folder = ROOT / "out/peers"
    output(SERVER, "simulate", ROOT / "tests/peers/block.toml", "--rate", rate_hz, "--duration", 0.5, "--threads", 1,
           "--out", folder)
    with open(folder / "profile.csv", newline="") as profile:
        # A body at rest sleeps: those steps cost nothing and compare nothing.
        awake = [float(row["total_ns"]) * 1e-6 for row in csv.DictReader(profile) if int(row["solves"]) > 0]
    with open(folder / "tracked_points.csv", newline="") as points:
        last = list(csv.DictReader(points))[-1]
    sag_m = -float(next(value for name, value in last.items() if name.startswith("top") and "y" in name))
    return {"peer": "Kerf", "rate_hz": rate_hz, "elements": 810, "step_ms": statistics.median(awake), "sag_m": sag_m}


def main():
    runs = {}
    for _ in range(ROUNDS):
        lines = output(RAPIER) + output(sys.executable, ROOT / "tests/peers/mujoco_flex.py")
        found = [ours(1000), ours(60)] + [json.loads(line) for line in lines.splitlines() if line.startswith("{")]
        for run in found:
            runs.setdefault((run["rate_hz"], run["peer"]), []).append(run)
    rows = []
    for (rate_hz, peer), of in sorted(runs.items(), key=lambda item: -item[0][0]):
        step_ms = statistics.median(run["step_ms"] for run in of)
        own_ms = statistics.median(run["step_ms"] for run in runs[rate_hz, "Kerf"])
        said = f" ({of[0]['warnings']} warnings: not converged)" if of[0].get("warnings") else ""
        rows.append(f"| {peer}{said} | {rate_hz:.0f} | {of[0]['elements']} | {step_ms:.2f} | {step_ms / own_ms:.1f} | "
                    f"{of[0]['sag_m'] * 1e3:.4f} |\n")
    free_mm = 1000 * 9.81 * 0.09**2 / (2 * 1.5e6) * 1e3
    (ROOT / "docs/explanation/peers.md").write_text(HEAD.format(rounds=ROUNDS, free=free_mm) + "".join(rows))
    print("docs/explanation/peers.md", *rows, sep="\n")


main()
