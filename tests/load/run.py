"""Finds how many livers a server keeps at 60 Hz and what viewers cost it: writes docs/reference/load/*.csv, and from these
docs/explanation/load.md. `run.py --page-only` writes the page alone."""

import csv
import json
import os
import pathlib
import statistics
import subprocess
import sys
import textwrap
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
SERVER, CLIENT = ROOT / "target/release/kerf-server", ROOT / "target/release/kerf-load"
TABLES, PAGE = ROOT / "docs/reference/load", ROOT / "docs/explanation/load.md"
ADDRESS = "127.0.0.1:50163"
RATE_HZ, DURATION_S = 60, 15
# One of so many sessions is cut.
CUT_ONE_OF = 4
SESSIONS = [8, 16, 20, 24, 28, 32]
MOST_LATE = 0.01
VIEWERS, PAIRS = (1, 50), 3
# Longer than a liver takes to be built.
BUILD_S = 0.3
# What a second of a processor is counted in.
TICKS = os.sysconf("SC_CLK_TCK")


def ticks(pid):
    return sum(int(field) for field in pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")")[1].split()[11:13])


def machine_ticks():
    # user, nice, system, interrupts.
    fields = [int(field) for field in pathlib.Path("/proc/stat").read_text().split("\n")[0].split()[1:]]
    return sum(fields[i] for i in (0, 1, 2, 5, 6))


def cores_busy(server, client, sessions):
    """Cores that the server, the client and all else keep busy, over a third of the time that sessions are driven."""
    time.sleep(DURATION_S / 5 + BUILD_S * sessions)
    began, before = time.monotonic(), (ticks(server.pid), ticks(client.pid), machine_ticks())
    time.sleep(DURATION_S / 3)
    after, elapsed = (ticks(server.pid), ticks(client.pid), machine_ticks()), time.monotonic() - began
    server_cores, client_cores, all_cores = [(b - a) / TICKS / elapsed for a, b in zip(before, after)]
    return server_cores, client_cores, all_cores - server_cores - client_cores


def run(sessions, stations, viewers, *settings):
    """One run of a server and a client that drives some of its sessions."""
    sets = [part for setting in settings for part in ("--set", setting)]
    server = subprocess.Popen([SERVER, "serve", "--listen", ADDRESS, "--log-filter", "error", *sets])
    report = ROOT / "out/load.json"
    report.parent.mkdir(exist_ok=True)
    try:
        client = subprocess.Popen(
            [CLIENT, "--server", f"http://{ADDRESS}", "--wait-for-server", "10", "--scene", "liver", "--progress", "off",
             "--step-rates", str(RATE_HZ), "--strokes", "4", "--duration", str(DURATION_S), "--json", report,
             "--sessions", str(sessions), "--stations", str(stations), "--viewers", str(viewers)],
            stdout=subprocess.DEVNULL)
        busy = cores_busy(server, client, sessions)
        if client.wait() != 0:
            sys.exit("kerf-load failed")
    finally:
        server.terminate()
        server.wait()
    told = json.loads(report.read_text())
    asked, server_told, resting = told["sessions"], told["server"], told["sessions"]["resting"] or {}
    rest = resting.get("steps", {})
    row = {
        "sessions": asked["driven"] + resting.get("sessions", 0), "driven": asked["driven"], "viewers": viewers,
        "refused": sum(refusal["count"] for refusal in asked["refusals"]),
        "late_share": server_told["late_step_share"], "resting_late_share": rest.get("late_step_share", 0.0),
        "step_ms": server_told["step_mean_ms"], "resting_step_ms": rest.get("step_mean_ms", 0.0),
        "lag_p99_ms": server_told["lag_ms"]["p99"],
        "round_trip_p50_ms": told["round_trip_ms"]["p50"], "round_trip_p99_ms": told["round_trip_ms"]["p99"],
        "force_age_p99_ms": told["force_age_ms"]["p99"],
        "skipped_poses": told["poses"]["skipped"], "unanswered_poses": told["poses"]["unanswered"],
        "viewer_bytes_per_s": told["view"]["bytes_per_s"],
        "server_cores": busy[0], "client_cores": busy[1], "other_cores": busy[2],
        "refusal": "; ".join(refusal["words"] for refusal in asked["refusals"]),
    }
    print({name: round(value, 4) if isinstance(value, float) else value for name, value in row.items()}, flush=True)
    return row


def write(name, rows):
    TABLES.mkdir(parents=True, exist_ok=True)
    with open(TABLES / name, "w", newline="") as file:
        table = csv.DictWriter(file, rows[0], lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def measure():
    rows = []
    for sessions in SESSIONS:
        rows.append(run(sessions, sessions // CUT_ONE_OF, 1))
        if rows[-1]["refused"] or rows[-1]["late_share"] > MOST_LATE:
            break
    write("sessions.csv", rows)
    pairs = [run(1, 1, viewers, "session.max_viewers=64") for _ in range(PAIRS) for viewers in VIEWERS]
    write("viewers.csv", pairs)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], check=True, capture_output=True, text=True, cwd=ROOT)
    (TABLES / "commit.txt").write_text(commit.stdout)
    model = next(line for line in open("/proc/cpuinfo") if line.startswith("model name")).split(":")[1].strip()
    (TABLES / "machine.txt").write_text(f"{model}, {os.cpu_count()} cores\n")


def read(name):
    with open(TABLES / name, newline="") as file:
        rows = list(csv.DictReader(file))
    return [{key: value if key == "refusal" else float(value) for key, value in row.items()} for row in rows]


def page():
    sessions, viewers = read("sessions.csv"), read("viewers.csv")
    kept = [row for row in sessions if row["late_share"] <= MOST_LATE]
    last = sessions[-1]
    if last["refused"]:
        end = f"""Of {last['sessions'] + last['refused']:.0f} sessions the server refused {last['refused']:.0f}, in these words:

```text
{textwrap.fill(last['refusal'], 120)}
```"""
    elif last["late_share"] > MOST_LATE:
        end = f"With {last['sessions']:.0f} sessions {100 * last['late_share']:.1f} % of the steps of those that are cut were late."
    else:
        end = "The knee lies beyond the last row."
    lines = "".join(
        f"| {row['sessions']:.0f} | {row['driven']:.0f} | {100 * row['late_share']:.2f} | "
        f"{100 * row['resting_late_share']:.2f} | {row['step_ms']:.2f} | {row['resting_step_ms']:.3f} | "
        f"{row['lag_p99_ms']:.1f} | {row['round_trip_p50_ms']:.1f}, {row['round_trip_p99_ms']:.1f} | "
        f"{row['force_age_p99_ms']:.1f} | {row['skipped_poses']:.0f}, {row['unanswered_poses']:.0f} | "
        f"{row['viewer_bytes_per_s'] / 1e3:.0f} | {row['server_cores']:.2f} | {row['client_cores']:.2f} | "
        f"{max(row['other_cores'], 0):.2f} |\n"
        for row in sessions)
    pairs = list(zip(viewers[::2], viewers[1::2]))
    beside = "".join(
        f"| {many['step_ms'] / one['step_ms']:.2f} | {100 * one['late_share']:.2f} | {100 * many['late_share']:.2f} | "
        f"{one['viewer_bytes_per_s'] / 1e3:.0f}, {many['viewer_bytes_per_s'] / 1e3:.0f} | "
        f"{one['server_cores']:.2f}, {many['server_cores']:.2f} | {max(one['other_cores'], 0):.2f}, {max(many['other_cores'], 0):.2f} |\n"
        for one, many in pairs)
    ratio = statistics.median(many["step_ms"] / one["step_ms"] for one, many in pairs)
    PAGE.write_text(f"""# Load

Written by `make load`, which measures for six minutes, from its [tables](../reference/load/README.md); figures of commit
{(TABLES / 'commit.txt').read_text().strip()}, on an {(TABLES / 'machine.txt').read_text().strip()}.

Most livers at {RATE_HZ} Hz with at most {100 * MOST_LATE:.0f} % of their steps late:
**{max((row['sessions'] for row in kept), default=0):.0f}**, of which one in {CUT_ONE_OF} was cut. {end}

## How it is measured

    kerf-server serve
    kerf-load --scene liver --step-rates {RATE_HZ} --sessions 24 --stations 6 --viewers 1 --strokes 4 --duration {DURATION_S}

Server and client share the machine. Each session has a viewer with a replica; stations cut at 250 poses a second. The client
is open-loop: each pose has a fixed due time, and its round trip counts from there. Poses that the client had to skip count
as if they had been sent, and unanswered ones with the time that they had waited. So a server that stalls gets the same load.

## Sessions

Lateness, round trip (p50, p99), age of forces and bytes are those of the sessions that are cut. The last three columns are the
cores that the server, the client and all else on the machine kept busy.

| sessions | cut | late, % | of those at rest, % | step, ms | at rest, ms | lag p99, ms | round trip, ms | force age p99, ms | poses skipped, unanswered | kB/s a viewer | server | client | others |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|
{lines}
A session at rest sleeps: its steps take next to nothing, and its cost is its viewer. New sessions are refused when the steps
of the running ones, estimated or measured, keep `session.max_load` cores busy. The estimate assumes a session that is cut now
and then. Where all are cut at once, lower the limit. Sessions in lock-step have no deadline: memory
(`session.max_memory_mib`) bounds them, and they take turns call by call.

## Viewers

One session that is cut, with {VIEWERS[1]} viewers and with {VIEWERS[0]}, in turns. The step takes {ratio:.2f} times as long (median).

| step, over that with {VIEWERS[0]} viewer | late with {VIEWERS[0]}, % | late with {VIEWERS[1]}, % | kB/s a viewer | server, cores | others, cores |
|---|---|---|---|---|---|
{beside}""")
    print(PAGE)


if "--page-only" not in sys.argv:
    measure()
page()
