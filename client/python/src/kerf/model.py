"""What a server tells of scenes and sessions, as values. SI units, named at the end of a field's name.

Frames are those of the protocol. Scene: right-handed, metres, +y up, +z toward the user. Tool: the origin is the middle
of the edge, +x along the edge, -y the cutting direction, +z the blade's normal. Quaternions are x, y, z, w.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum, IntFlag
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from kerf.v1 import control_pb2, session_pb2, types_pb2

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import Self

Floats = NDArray[np.float64]


class SessionState(Enum):
    """What a session is doing."""

    RUNNING = types_pb2.SESSION_STATE_RUNNING
    PAUSED = types_pb2.SESSION_STATE_PAUSED
    CLOSING = types_pb2.SESSION_STATE_CLOSING
    FAILED = types_pb2.SESSION_STATE_FAILED


class ContactFlags(IntFlag):
    """What is true of a tool after a step."""

    LIFTED = control_pb2.CONTACT_FLAG_LIFTED
    REENTERED = control_pb2.CONTACT_FLAG_REENTERED
    LATE = control_pb2.CONTACT_FLAG_LATE
    HOLDING = control_pb2.CONTACT_FLAG_HOLDING
    SLIPPED = control_pb2.CONTACT_FLAG_SLIPPED
    WAITS_UNTIL_CLEAR = control_pb2.CONTACT_FLAG_WAITS_UNTIL_CLEAR


@dataclass(frozen=True)
class EnergyLedger:
    """Energies and works since the session began or was reset, J.

    tool + load = elastic + contact + kinetic + fracture + front_slip + initiation + damping + friction + parting
    + contact_loss + numerical + residual.
    """

    tool_work_j: float = 0.0
    load_work_j: float = 0.0
    elastic_j: float = 0.0
    contact_j: float = 0.0
    kinetic_j: float = 0.0
    fracture_j: float = 0.0
    front_slip_j: float = 0.0
    initiation_j: float = 0.0
    parting_j: float = 0.0
    damping_j: float = 0.0
    numerical_j: float = 0.0
    residual_j: float = 0.0
    friction_j: float = 0.0
    contact_loss_j: float = 0.0


#: Names of the energies, in the order of the columns of `StepResult.energies_j`.
ENERGY_TERMS: tuple[str, ...] = tuple(field.name for field in fields(EnergyLedger))


def energies_of(message: session_pb2.EnergyLedger) -> list[float]:
    """The energies of a message, in the order of `ENERGY_TERMS`."""
    return [getattr(message, term) for term in ENERGY_TERMS]


@dataclass(frozen=True)
class Making:
    """How far a scene is that is being made."""

    #: `"reading"`, `"voxels"`, `"elements"`, `"solver"` or `"equilibrium"`; `"unspecified"`: another.
    stage: str
    #: The object that is made, from 0, and how many there are; 0: the scene is not read yet.
    object: int
    objects: int
    #: Fine voxels and composite elements of the object; 0: not counted yet.
    voxels: int
    composite_elements: int
    #: Done of the whole, 0 to 1: an estimate, which never falls.
    share: float

    @classmethod
    def of(cls, told: session_pb2.MakingProgress) -> Self:
        """From the wire."""
        stages = session_pb2.MakingStage
        # A server of another version may have stages that this does not know.
        known = told.stage if told.stage in stages.values() else session_pb2.MAKING_STAGE_UNSPECIFIED
        stage = stages.Name(known).removeprefix("MAKING_STAGE_").lower()
        return cls(stage, told.object, told.objects, told.voxels, told.composite_elements, told.share)


@dataclass(frozen=True)
class Tool:
    """A tool of a scene."""

    index: int
    name: str
    #: `"blade"`, `"scissors"`, `"grasper"` or `"probe"`.
    kind: str
    #: Points of a blade's edge, tool frame; no rows for other tools.
    edge_m: Floats


@dataclass(frozen=True)
class SceneObject:
    """A soft body of a scene."""

    name: str
    rest_min_m: Floats
    rest_max_m: Floats
    young_modulus_pa: float
    #: Main material's; `None`: it cannot be cut.
    fracture_energy_j_per_m2: float | None
    voxel_size_m: float
    voxels: int
    composite_elements: int
    #: `Surface.materials` are indices into these.
    material_names: tuple[str, ...]
    #: As `"#rrggbb"`, sRGB, of each of these; empty where the scene states none.
    material_colors: tuple[str, ...]


@dataclass(frozen=True)
class Scene:
    """A scene, as far as a client has to know it."""

    name: str
    description: str
    dt_s: float
    objects: tuple[SceneObject, ...]
    tools: tuple[Tool, ...]
    tracked_point_names: tuple[str, ...]


@dataclass(frozen=True)
class SessionStatus:
    """How a session is doing."""

    session_id: str
    state: SessionState
    step: int
    sim_time_s: float
    topology_version: int
    late_steps: int
    viewers: int
    driven_tools: tuple[int, ...]
    energy: EnergyLedger
    tracked_displacements_m: Floats
    state_hash: int
    #: Why a session in `SessionState.FAILED` failed.
    failure: str
    relative_tolerance: float
    #: Time of a step over the time that it has; 1 and more: steps are late.
    load: float
    memory_bytes: int


@dataclass(frozen=True)
class Checkpoint:
    """A state that a session can go back to."""

    name: str
    step: int
    sim_time_s: float


@dataclass(frozen=True)
class SceneInfo:
    """A scene that can be created by name."""

    name: str
    description: str


@dataclass(frozen=True, repr=False)
class StepResult:
    """What steps have led to: arrays with a row for each step.

    With n steps, t tools, p tracked points; tools and points are in the order of the scene.
    """

    #: Steps taken after each. (n,)
    steps: NDArray[np.int64]
    sim_time_s: Floats
    #: Force on each tool, scene frame. (n, t, 3)
    force_n: Floats
    #: Torque on each tool about its reference point, scene frame. (n, t, 3)
    torque_nm: Floats
    #: Length of each tool's edge whose front is yielding; 0 while nothing is cut. (n, t)
    cutting_length_m: Floats
    #: `ContactFlags` of each tool. (n, t)
    flags: NDArray[np.uint32]
    #: Where each tool was: position in metres, then a quaternion x, y, z, w; not a number while it is lifted, or where
    #: this session has not placed it. (n, t, 7)
    poses: Floats
    #: How far each tool has gone the way it cuts since it first touched, m; 0 while it is out. Of jaws that hold
    #: tissue: how far they have pulled it, whichever way. (n, t)
    depth_m: Floats
    #: In the order of `ENERGY_TERMS`. (n, 14)
    energies_j: Floats
    #: Scene frame. (n, p, 3)
    tracked_displacements_m: Floats
    #: After the last step.
    topology_version: int
    #: Of positions, velocities, fronts and topology after the last step.
    state_hash: int

    def __len__(self) -> int:
        return len(self.steps)

    def __repr__(self) -> str:
        """Six lines: what happened, without the arrays."""
        tools = range(self.force_n.shape[1])
        forces_n = np.linalg.norm(self.force_n, axis=2)
        # The tool that felt most.
        tool = int(np.argmax(forces_n.max(axis=0))) if len(tools) else 0
        felt_n = forces_n[:, tool] if len(tools) else np.zeros(1)
        depth_m, edge_m = (of[-1, tool] if len(tools) else 0.0 for of in (self.depth_m, self.cutting_length_m))
        energy = self.energy
        return "\n".join(
            [
                f"StepResult of {len(self)} steps, to step {self.steps[-1]} at {self.sim_time_s[-1]:.3f} s",
                f"  force   {felt_n[-1]:.4g} N at the end, {felt_n.max():.4g} N at most (tool {tool} of {len(tools)})",
                f"  depth   {1e3 * depth_m:.2f} mm; {1e3 * edge_m:.1f} mm of its edge cut",
                f"  energy  {energy.tool_work_j:.4g} J from tools, {energy.elastic_j:.4g} J stored",
                f"  cut     {energy.fracture_j:.4g} J, structure {self.topology_version}",
                f"  state   {self.state_hash:016x}",
            ]
        )

    @property
    def energy(self) -> EnergyLedger:
        """Energies after the last step."""
        return EnergyLedger(*self.energies_j[-1].tolist())

    def energy_j(self, term: str) -> Floats:
        """One of the energies, by its name without the unit (`"fracture"`), after each step."""
        return self.energies_j[:, ENERGY_TERMS.index(f"{term}_j")]

    @staticmethod
    def concatenated(results: Iterable[StepResult]) -> StepResult:
        """The results of calls one after the other, as one."""
        parts = list(results)
        if not parts:
            raise ValueError("no results")
        arrays = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in fields(StepResult)
            if field.name not in ("topology_version", "state_hash")
        }
        last = parts[-1]
        return StepResult(**arrays, topology_version=last.topology_version, state_hash=last.state_hash)


def step_result(message: session_pb2.StepSessionResponse) -> StepResult:
    """Arrays of an answer's steps. It does not say where tools were: who told them knows (`ToolWay`)."""
    outcomes = message.outcomes
    n, tools, points = len(outcomes), len(outcomes[0].contacts), len(outcomes[0].tracked_displacements_m)
    felt = [
        (f.x, f.y, f.z, q.x, q.y, q.z, contact.cutting_length_m)
        for outcome in outcomes
        for contact in outcome.contacts
        for f, q in [(contact.wrench.force_n, contact.wrench.torque_nm)]
    ]
    per_tool = np.array(felt, dtype=np.float64).reshape(n, tools, 7)
    moved = [(u.x, u.y, u.z) for outcome in outcomes for u in outcome.tracked_displacements_m]
    return StepResult(
        steps=np.array([outcome.step for outcome in outcomes], dtype=np.int64),
        sim_time_s=np.array([outcome.sim_time_s for outcome in outcomes]),
        force_n=per_tool[..., 0:3],
        torque_nm=per_tool[..., 3:6],
        cutting_length_m=per_tool[..., 6],
        flags=np.array([[c.flags for c in outcome.contacts] for outcome in outcomes], dtype=np.uint32),
        poses=np.full((n, tools, 7), np.nan),
        depth_m=np.zeros((n, tools)),
        energies_j=np.array([energies_of(outcome.energy) for outcome in outcomes]),
        tracked_displacements_m=np.array(moved, dtype=np.float64).reshape(n, points, 3),
        topology_version=message.topology_version,
        state_hash=message.state_hash,
    )


def xyz(vector: types_pb2.Vec3) -> Floats:
    """A vector as an array."""
    return np.array([vector.x, vector.y, vector.z])


def scene(summary: types_pb2.SceneSummary) -> Scene:
    """The scene of a message."""
    return Scene(
        name=summary.name,
        description=summary.description,
        dt_s=summary.dt_s,
        objects=tuple(_scene_object(summary_of) for summary_of in summary.objects),
        tools=tuple(_tool(index, tool) for index, tool in enumerate(summary.tools)),
        tracked_point_names=tuple(summary.tracked_point_names),
    )


def _scene_object(summary: types_pb2.ObjectSummary) -> SceneObject:
    is_cuttable = summary.HasField("fracture_energy_j_per_m2")
    return SceneObject(
        name=summary.name,
        rest_min_m=xyz(summary.rest_min_m),
        rest_max_m=xyz(summary.rest_max_m),
        young_modulus_pa=summary.young_modulus_pa,
        fracture_energy_j_per_m2=summary.fracture_energy_j_per_m2 if is_cuttable else None,
        voxel_size_m=summary.voxel_size_m,
        voxels=summary.voxels,
        composite_elements=summary.composite_elements,
        material_names=tuple(summary.material_names),
        material_colors=tuple(summary.material_colors),
    )


def _tool(index: int, summary: types_pb2.ToolSummary) -> Tool:
    edge_m = np.array(summary.blade.edge_m, dtype=np.float64).reshape(-1, 3)
    return Tool(index=index, name=summary.name, kind=summary.WhichOneof("kind") or "", edge_m=edge_m)


def session_status(message: session_pb2.SessionDescription) -> SessionStatus:
    """The status of a message."""
    moved = [(u.x, u.y, u.z) for u in message.tracked_displacements_m]
    return SessionStatus(
        session_id=message.session_id,
        state=SessionState(message.state),
        step=message.step,
        sim_time_s=message.sim_time_s,
        topology_version=message.topology_version,
        late_steps=message.late_steps,
        viewers=message.viewers,
        driven_tools=tuple(message.leased_tool_ids),
        energy=EnergyLedger(*energies_of(message.energy)),
        tracked_displacements_m=np.array(moved, dtype=np.float64).reshape(-1, 3),
        state_hash=message.state_hash,
        failure=message.failure,
        relative_tolerance=message.relative_tolerance,
        load=message.load,
        memory_bytes=message.memory_bytes,
    )
