"""Force over depth in jelly, tofu and rubber, the three materials of Fig. 12 of He et al. (2022).

Run it with `--program PATH/kerf-server --out force_depth.png`; it takes ten seconds.

The paper shows the cuts; here stand the curves behind them. A level blade goes down through the middle of the same dome
of each material. Jelly dents deepest before it parts, rubber least.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np

import kerf
from kerf.model import Floats

mpl.use("Agg")
from matplotlib import pyplot as plt

MATERIALS = {"jelly": "#d1495b", "tofu": "#8d8741", "rubber": "#30638e"}
#: Top of the dome, and where the blade begins and ends, m.
TOP_M, START_M, END_M = 0.055, 0.057, 0.03


@dataclass(frozen=True)
class Curve:
    """Force on a blade on its way down."""

    #: Of the edge below the top of the dome.
    depth_m: Floats
    force_n: Floats
    #: Depth at which the blade begins to cut.
    first_cut_m: float
    #: Gc times the width of the edge: what a steady cut takes by theory.
    steady_n: float


def force_depth(client: kerf.Client, scene: str, speed_m_per_s: float) -> Curve:
    """Presses the blade through the dome of a scene."""
    poses = np.array([[0, START_M, 0, 0, 0, 0, 1], [0, END_M, 0, 0, 0, 0, 1]], dtype=float)
    duration_s = (START_M - END_M) / speed_m_per_s
    with client.create_session(scene) as session:
        result = session.drive([0.0, duration_s], poses)
    depth_m = TOP_M - np.interp(result.sim_time_s, [0.0, duration_s], [START_M, END_M])
    is_cutting = result.cutting_length_m[:, 0] > 0.0
    first_cut_m = depth_m[np.argmax(is_cutting)] if is_cutting.any() else np.nan
    energy = result.energy
    print(
        f"{scene}: first cut {1e3 * first_cut_m:.1f} mm deep, most {result.force_n[:, 0, 1].max():.0f} N, cut took "
        f"{energy.fracture_j:.2f} J of the blade's {energy.tool_work_j:.2f} J, state hash {result.state_hash:016x}"
    )
    toughness_j_per_m2 = session.scene.objects[0].fracture_energy_j_per_m2 or 0.0
    steady_n = toughness_j_per_m2 * float(np.ptp(session.scene.tools[0].edge_m[:, 0]))
    return Curve(depth_m, result.force_n[:, 0, 1], float(first_cut_m), steady_n)


def main() -> None:
    """Runs the three materials and draws the plot."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--program", default="kerf-server", help="the server to start")
    arguments.add_argument("--speed", type=float, default=0.05, help="of the blade, m/s")
    arguments.add_argument("--out", type=Path, default=Path("force_depth.png"))
    given = arguments.parse_args()
    figure, axes = plt.subplots(figsize=(7.0, 4.2), layout="constrained")
    with kerf.LocalServer(given.program) as server, server.client() as client:
        for scene, colour in MATERIALS.items():
            curve = force_depth(client, scene, given.speed)
            axes.axhline(curve.steady_n, color=colour, linestyle=":", linewidth=1.0)
            axes.plot(1e3 * curve.depth_m, curve.force_n, color=colour, label=scene)
            axes.plot(
                1e3 * curve.first_cut_m, np.interp(curve.first_cut_m, curve.depth_m, curve.force_n), "o", color=colour
            )
    axes.set(xlabel="depth of the edge below the top, mm", ylabel="force on the blade, N")
    axes.set_title(
        "A blade on its way into three materials\ndots: it begins to cut; dotted: Gc times the width of the edge"
    )
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(given.out, dpi=150)
    print(f"wrote {given.out}")


if __name__ == "__main__":
    main()
