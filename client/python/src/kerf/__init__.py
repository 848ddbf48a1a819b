"""Client of Kerf, the networked soft-tissue cutting simulator.

Begin with `Client`, or `LocalServer` where no server runs yet; `kerf.gym` has an environment for learning.
"""

import contextlib

from kerf.body import Surface
from kerf.client import Client
from kerf.control import Contact, Control
from kerf.errors import (
    AccessDeniedError,
    DeadlineError,
    FailedPreconditionError,
    InvalidArgumentError,
    KerfError,
    MovedError,
    NotFoundError,
    PoseRejectedError,
    ReplicaError,
    ResourceExhaustedError,
    StepsEndedError,
    UnavailableError,
)
from kerf.gym import register as _register
from kerf.local_server import LocalServer
from kerf.model import (
    ENERGY_TERMS,
    Checkpoint,
    ContactFlags,
    EnergyLedger,
    Making,
    Scene,
    SceneInfo,
    SceneObject,
    SessionState,
    SessionStatus,
    StepResult,
    Tool,
)
from kerf.motion import Placement
from kerf.recording import Recording
from kerf.session import Session, Steps
from kerf.station_log import StationLog, read_log
from kerf.view import View

# The ids of its environments are known from here on, where Gymnasium is installed.
with contextlib.suppress(ImportError):
    _register()

__all__ = [
    "ENERGY_TERMS",
    "AccessDeniedError",
    "Checkpoint",
    "Client",
    "Contact",
    "ContactFlags",
    "Control",
    "DeadlineError",
    "EnergyLedger",
    "FailedPreconditionError",
    "InvalidArgumentError",
    "KerfError",
    "LocalServer",
    "Making",
    "MovedError",
    "NotFoundError",
    "Placement",
    "PoseRejectedError",
    "Recording",
    "ReplicaError",
    "ResourceExhaustedError",
    "Scene",
    "SceneInfo",
    "SceneObject",
    "Session",
    "SessionState",
    "SessionStatus",
    "StationLog",
    "StepResult",
    "Steps",
    "StepsEndedError",
    "Surface",
    "Tool",
    "UnavailableError",
    "View",
    "read_log",
]
