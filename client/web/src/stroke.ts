// How deep a tool is: how far it has gone along its cutting direction since it first touched. Of jaws that hold tissue: how
// far they have pulled it, whichever way.

import { Quaternion, Vector3 } from "three";
import type { Sample, ToolFrame } from "./net/frames";
import type { PlotPoint } from "./ui/plot";

export class Stroke {
  private touched: { at: Vector3; forward: Vector3 } | undefined;
  /** Where the jaws took hold. */
  private held: Vector3 | undefined;

  /** What a plot shows of a tool. */
  points(samples: readonly Sample[], toolId: number): PlotPoint[] {
    return samples.map(({ simTimeS, tools }) => {
      const tool = tools[toolId];
      return { timeS: simTimeS, forceN: Math.hypot(...tool.forceN), depthM: this.depthM(tool) };
    });
  }

  private depthM({ pose, forceN, isHolding }: ToolFrame): number {
    if (!pose) {
      this.touched = this.held = undefined;
      return 0;
    }
    const at = new Vector3(...pose.position);
    this.held = isHolding ? (this.held ?? at) : undefined;
    if (this.held) return at.distanceTo(this.held);
    const touches = forceN.some((component) => component !== 0);
    if (touches && !this.touched) {
      this.touched = { at, forward: new Vector3(0, -1, 0).applyQuaternion(new Quaternion(...pose.orientation)) };
    }
    if (!this.touched) return 0;
    const depthM = at.clone().sub(this.touched.at).dot(this.touched.forward);
    // Back out, and in the air: the next touch begins anew.
    if (!touches && depthM <= 0) this.touched = undefined;
    return Math.max(0, depthM);
  }
}
