// How long the neck of a tool is: however deep its working end is, its grip stays out of the tissue.

import { Quaternion, Vector3 } from "three";
import type { ToolFrame } from "../net/frames";

/** Air that grips are kept in, in sizes of the scene. */
const CLEARANCE = 0.05;
/** Two thirds of what a neck is too short or too long by are made up in this time, s. */
const EASE_S = 0.07;

/** The way from the working end of a tool to its grip. */
export interface Neck {
  /** Where it begins, and its direction from there, in the tool frame. */
  foot: Vector3;
  along: Vector3;
  /** Length in the air, m. */
  leastM: number;
  /** How far the grip reaches from the line that the neck goes along, m. */
  reachM: number;
}

export class NeckLength {
  private readonly neck: Neck;
  private readonly clearM: number;
  private lengthM: number;
  /** It has touched tissue, and not come out since. */
  private isIn = false;
  private before: { timeS: number; foot: Vector3 } | undefined;

  constructor(neck: Neck, sceneSizeM: number) {
    this.neck = neck;
    this.clearM = CLEARANCE * sceneSizeM;
    this.lengthM = neck.leastM;
  }

  /** The length at a sim time, m, among tissues with vertices at these positions, m. */
  follow(tool: ToolFrame, timeS: number, tissues: readonly Float32Array[]): number {
    if (!tool.pose) {
      this.isIn = false;
      this.before = undefined;
      return this.lengthM;
    }
    const turn = new Quaternion(...tool.pose.orientation);
    const foot = this.neck.foot.clone().applyQuaternion(turn).add(new Vector3(...tool.pose.position));
    const along = this.neck.along.clone().applyQuaternion(turn);
    this.ease(this.wantedM(tool, foot, along, tissues), foot, along, timeS);
    this.before = { timeS, foot };
    return this.lengthM;
  }

  /** A tool that has touched nothing yet has the neck that it has in the air, whatever is above it. */
  private wantedM(tool: ToolFrame, foot: Vector3, along: Vector3, tissues: readonly Float32Array[]): number {
    const touches = tool.isHolding || tool.forceN.some((component) => component !== 0);
    if (!touches && !this.isIn) return this.neck.leastM;
    const clearM = this.clearM + farthestM(foot, along, this.neck.reachM + this.clearM, tissues);
    this.isIn = touches || clearM > this.neck.leastM;
    return Math.max(this.neck.leastM, clearM);
  }

  private ease(wantedM: number, foot: Vector3, along: Vector3, timeS: number): void {
    const before = this.before;
    // There is nothing to go on from.
    if (!before || timeS < before.timeS) {
      this.lengthM = wantedM;
      return;
    }
    // The grip of a tool that goes deeper stays where it is.
    if (wantedM > this.neck.leastM) this.lengthM += Math.max(0, before.foot.sub(foot).dot(along));
    this.lengthM += (wantedM - this.lengthM) * (1 - Math.exp((before.timeS - timeS) / EASE_S));
  }
}

/** How far along a line tissue reaches within a distance of it, m from the line's foot. */
function farthestM(foot: Vector3, along: Vector3, withinM: number, tissues: readonly Float32Array[]): number {
  let farthestM = Number.NEGATIVE_INFINITY;
  for (const positions of tissues) {
    for (let i = 0; i < positions.length; i += 3) {
      const x = positions[i] - foot.x;
      const y = positions[i + 1] - foot.y;
      const z = positions[i + 2] - foot.z;
      const wayM = x * along.x + y * along.y + z * along.z;
      if (wayM > farthestM && x * x + y * y + z * z - wayM * wayM < withinM * withinM) farthestM = wayM;
    }
  }
  return farthestM;
}
