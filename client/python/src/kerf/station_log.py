"""What a station's servos did, from the file that `kerf-station run --log` writes. Needs `pip install kerf[log]`."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kerf.errors import KerfError
from kerf.model import Floats


@dataclass(frozen=True, repr=False)
class StationLog:
    """The ticks of one device, in order; a row for each. Scene frame, SI units."""

    #: Name of the device.
    device: str
    #: Since the first tick. (n,)
    time_s: Floats
    #: Time since the tick before. (n,)
    dt_s: Floats
    #: `"stale"`, `"held"`, `"tripped"`, `"ramping"` or `"rendering"`. (n,)
    state: NDArray[np.str_]
    #: Where the tool is to be: position, then a quaternion x, y, z, w; not a number while it is out. (n, 7)
    poses: Floats
    #: On the hand, in the scene's scale. (n, 3)
    force_n: Floats
    #: Of the contact, before anything is held back. (n, 3)
    contact_n: Floats
    coupling_n_per_m: Floats
    #: Contacts that came in so far. (n,)
    contacts: NDArray[np.int64]
    #: Age of the motion that the newest contact reflects; not a number before the first. (n,)
    motion_age_s: Floats
    #: Of the newest contact, about its reference; not a number where nothing is touched. (n, 3, 3)
    stiffness_n_per_m: Floats
    #: In the device's own frame: position and quaternion, and the force on it. (n, 7) and (n, 3)
    device_poses: Floats
    device_force_n: Floats

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        most_n = np.linalg.norm(self.device_force_n, axis=1).max(initial=0.0)
        lasted = f"{len(self)} ticks, {self.time_s[-1]:.3f} s"
        return f"StationLog({self.device!r}, {lasted}, {most_n:.3g} N on the hand at most)"


def read_log(path: str | Path) -> list[StationLog]:
    """Reads a station's log: one entry for each of its devices.

    A file that was cut off is read as far as it goes.

    Raises:
        KerfError: It is no such file, or `mcap` is not installed.
    """
    try:
        from mcap.exceptions import McapError
        from mcap.records import Channel, Message
        from mcap.stream_reader import StreamReader
    except ImportError as error:
        raise KerfError(f"a station's log needs what `pip install kerf[log]` installs: {error}") from error
    names: dict[int, str] = {}
    ticks: dict[int, list[dict[str, Any]]] = defaultdict(list)
    with Path(path).open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Channel) and record.topic.startswith("/device/"):
                    names[record.id] = record.metadata.get("device", record.topic)
                elif isinstance(record, Message) and record.channel_id in names:
                    ticks[record.channel_id].append(json.loads(record.data))
        except McapError as error:
            if not ticks:
                raise KerfError(f"{path} is not a station's log: {error}") from error
    if not names:
        raise KerfError(f"{path} is not a station's log: it has no devices")
    return [_arrays(name, ticks[channel]) for channel, name in names.items() if ticks[channel]]


def _arrays(device: str, ticks: list[dict[str, Any]]) -> StationLog:
    at_ns = np.array([tick["at_ns"] for tick in ticks], dtype=np.int64)
    absent = [np.nan] * 9
    stiffness = [tick["model"]["stiffness_n_per_m"] if tick["model"] else absent for tick in ticks]

    def numbers(name: str) -> Floats:
        return np.array([np.nan if tick[name] is None else tick[name] for tick in ticks], dtype=np.float64)

    return StationLog(
        device=device,
        time_s=(at_ns - at_ns[0]) * 1e-9,
        dt_s=numbers("dt_s"),
        state=np.array([tick["state"] for tick in ticks]),
        poses=np.array([_pose(tick["tool"]) for tick in ticks]),
        force_n=np.array([_xyz(tick["force_n"]) for tick in ticks]),
        contact_n=np.array([_xyz(tick["contact_n"]) for tick in ticks]),
        coupling_n_per_m=numbers("coupling_n_per_m"),
        contacts=np.array([tick["contacts"] for tick in ticks], dtype=np.int64),
        motion_age_s=numbers("motion_age_s"),
        stiffness_n_per_m=np.array(stiffness, dtype=np.float64).reshape(-1, 3, 3),
        device_poses=np.array([_pose(tick["device"]) for tick in ticks]),
        device_force_n=np.array([_xyz(tick["device"]["force_n"]) for tick in ticks]),
    )


def _xyz(vector: dict[str, float]) -> list[float]:
    return [vector["x"], vector["y"], vector["z"]]


def _pose(pose: dict[str, dict[str, float]] | None) -> list[float]:
    if pose is None:
        return [np.nan] * 7
    turn = pose["orientation"]
    return [*_xyz(pose["position_m"]), turn["x"], turn["y"], turn["z"], turn["w"]]
