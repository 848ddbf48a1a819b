"""Steps a soft block in MuJoCo's flex, implicitly, and prints a line of JSON a run."""

import json
import statistics
import time

import mujoco

NODES, SIDE_M, DURATION_S = 10, 0.09, 0.5
YOUNG_MODULUS_PA, POISSON_RATIO, DAMPING_S = 1.5e6, 0.4, 2e-4


def model(rate_hz):
    spacing, last = SIDE_M / (NODES - 1), NODES - 1
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{1 / rate_hz}" integrator="discrete" solver="CG" tolerance="1e-3"/>
  <worldbody>
    <flexcomp name="block" type="grid" dim="3" count="{NODES} {NODES} {NODES}" spacing="{spacing} {spacing} {spacing}"
              pos="0 0 {SIDE_M / 2}" radius="1e-4" mass="{1000 * SIDE_M**3}">
      <elasticity young="{YOUNG_MODULUS_PA}" poisson="{POISSON_RATIO}" damping="{DAMPING_S}"/>
      <contact contype="0" conaffinity="0" selfcollide="none"/>
      <pin gridrange="0 0 0 {last} {last} 0"/>
    </flexcomp>
  </worldbody>
</mujoco>""")


def run(rate_hz):
    block = model(rate_hz)
    data = mujoco.MjData(block)
    times_ms = []
    for _ in range(int(DURATION_S * rate_hz)):
        start = time.perf_counter()
        mujoco.mj_step(block, data)
        times_ms.append((time.perf_counter() - start) * 1e3)
    heights = data.flexvert_xpos[:, 2].reshape(NODES, NODES, NODES)
    top_m = max(heights[0, 0, :].mean(), heights[-1].mean(), heights[:, :, -1].mean(), heights[:, -1].mean())
    print(json.dumps({
        "peer": f"MuJoCo {mujoco.__version__}, flex, implicit",
        "rate_hz": rate_hz,
        "elements": block.nflexelem,
        "step_ms": statistics.median(times_ms),
        "sag_m": SIDE_M - top_m,
        "warnings": sum(int(warning.number) for warning in data.warning),
    }))


for rate_hz in (1000, 60):
    run(rate_hz)
