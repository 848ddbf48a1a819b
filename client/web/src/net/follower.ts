// A tool on its way to where its hand wants it. It follows at a hand's speed, however the pointer jumps, so that what is
// cut is cut in a sweep.

import { Quaternion, Vector3 } from "three";
import type { DrivenPose } from "./hands-messages";

/** Time in which a tool comes most of the way to where it is wanted, s. */
const FOLLOW_S = 0.05;
/** Sizes of the scene that a tool goes in a second, at most. */
const SPEED_PER_SIZE = 1.0;
const TURN_RAD_PER_S = 2.5;
const JAWS_PER_S = 3;

export class Follower {
  private readonly sceneSizeM: number;
  private readonly position: Vector3;
  private readonly turn: Quaternion;
  private opening: number;
  goal: DrivenPose;

  /** Begins where it is wanted. */
  constructor(sceneSizeM: number, goal: DrivenPose) {
    this.sceneSizeM = sceneSizeM;
    this.goal = goal;
    this.position = new Vector3(...goal.position);
    this.turn = new Quaternion(...goal.orientation);
    this.opening = goal.opening;
  }

  /** Where the tool is to be sent now. */
  get pose(): DrivenPose {
    const { position, turn, opening } = this;
    return { position: position.toArray(), orientation: [turn.x, turn.y, turn.z, turn.w], opening };
  }

  /** Goes on towards where the tool is wanted; says whether it moved. */
  follow(elapsedS: number): boolean {
    const share = 1 - Math.exp(-elapsedS / FOLLOW_S);
    const way = new Vector3(...this.goal.position).sub(this.position);
    const turn = new Quaternion(...this.goal.orientation);
    const angle = this.turn.angleTo(turn);
    const gap = this.goal.opening - this.opening;
    if (way.length() < 1e-6 * this.sceneSizeM && angle < 1e-4 && gap === 0) return false;
    this.position.add(way.multiplyScalar(share).clampLength(0, SPEED_PER_SIZE * this.sceneSizeM * elapsedS));
    this.turn.rotateTowards(turn, Math.min(share * angle, TURN_RAD_PER_S * elapsedS)).normalize();
    this.opening += Math.sign(gap) * Math.min(Math.abs(gap), JAWS_PER_S * elapsedS);
    return true;
  }
}
