// The hand of whoever sits at the page: where a tool is wanted, by mouse, finger or key.

import { type Camera, type PerspectiveCamera, Quaternion, Vector3 } from "three";
import type { DrivenPose } from "./net/hands-messages";

/** The camera looks down more steeply than this, rad: up and down on the screen is there and back on the table. */
const STEEP_RAD = 1.0;

const UP = new Vector3(0, 1, 0);

/** The way over which an edge that is drawn comes round to a drag, over the scene's size: a scalpel's half. */
const COMES_ROUND = 0.05;

/** What a drag does. */
export type Grip = "move" | "slice" | "draw" | "turn";

/** Directions that a drag to the right, a drag upwards and the wheel move along. */
interface WorkingAxes {
  right: Vector3;
  up: Vector3;
  away: Vector3;
  /** Away from the eye over the table. */
  level: Vector3;
}

interface Wanted {
  position: Vector3;
  turn: Quaternion;
  opening: number;
}

/** A tool in hand. */
export class Hand {
  readonly toolId: number;
  private readonly sceneSizeM: number;
  private readonly wanted: Wanted;
  private said: Wanted | undefined;

  constructor(toolId: number, sceneSizeM: number, position: Vector3, turn: Quaternion) {
    this.toolId = toolId;
    this.sceneSizeM = sceneSizeM;
    this.wanted = { position: position.clone(), turn: turn.clone(), opening: 1 };
  }

  /** Where the tool is wanted. */
  get goal(): DrivenPose {
    const { position, turn, opening } = this.wanted;
    return { position: position.toArray(), orientation: [turn.x, turn.y, turn.z, turn.w], opening };
  }

  /** Where the tool is wanted, if that is elsewhere than when this was asked last. */
  moved(): DrivenPose | undefined {
    const { position, turn, opening } = this.wanted;
    const said = this.said;
    if (said && position.equals(said.position) && turn.equals(said.turn) && opening === said.opening) return undefined;
    this.said = { position: position.clone(), turn: turn.clone(), opening };
    return this.goal;
  }

  get jawsAreOpen(): boolean {
    return this.wanted.opening > 0.5;
  }

  set jawsAreOpen(open: boolean) {
    this.wanted.opening = open ? 1 : 0;
  }

  /** A drag by some pixels over a canvas that is `heightPx` high. */
  drag(grip: Grip, xPx: number, yPx: number, camera: PerspectiveCamera, heightPx: number): void {
    const distanceM = camera.position.distanceTo(this.wanted.position);
    const mPerPx = (2 * distanceM * Math.tan((camera.fov * Math.PI) / 360)) / heightPx;
    const axes = workingAxes(camera);
    const right = axes.right;
    const up = grip === "draw" ? axes.level : axes.up;
    // The plane is seen at a slant; the tool stays under the pointer all the same.
    const slant = Math.max(0.4, Math.abs(up.dot(screenUp(camera))));
    const move = right.clone().multiplyScalar(xPx * mPerPx).addScaledVector(up, (-yPx * mPerPx) / slant);
    if (grip === "turn") {
      this.turn(UP, xPx * 0.008);
      this.turn(right, yPx * 0.008);
    } else if (grip === "slice") {
      this.slide(move, camera);
    } else if (grip === "draw") {
      this.draw(move);
    } else {
      this.moveBy(move);
    }
  }

  /** Moves along the axes of the screen, by shares of the scene's size. */
  nudge(right: number, up: number, away: number, camera: PerspectiveCamera): void {
    const axes = workingAxes(camera);
    const move = new Vector3();
    move.addScaledVector(axes.right, right).addScaledVector(axes.up, up).addScaledVector(axes.away, away);
    this.moveBy(move.multiplyScalar(this.sceneSizeM));
  }

  /** Turns about the vertical and tips about the axis across the screen. */
  twist(aboutUpRad: number, aboutRightRad: number, camera: Camera): void {
    this.turn(UP, aboutUpRad);
    this.turn(workingAxes(camera).right, aboutRightRad);
  }

  private moveBy(move: Vector3): void {
    // The server's workspace is a metre about the origin.
    this.wanted.position.add(move).clampScalar(-0.95, 0.95);
  }

  /** Along the edge alone: sideways on the screen, or upwards where the edge points away from the eye. */
  private slide(move: Vector3, camera: Camera): void {
    const edge = new Vector3(1, 0, 0).applyQuaternion(this.wanted.turn);
    const { right, up, away } = workingAxes(camera);
    const across = edge.dot(right);
    const isAcross = Math.abs(across) > 0.3;
    const along = isAcross ? move.dot(right) / across : move.dot(up) * Math.sign(edge.dot(away));
    this.moveBy(edge.multiplyScalar(along));
  }

  /** Over the table, and the edge comes round to the drag, either end first. */
  private draw(move: Vector3): void {
    const edge = new Vector3(1, 0, 0).applyQuaternion(this.wanted.turn);
    edge.multiplyScalar(Math.sign(edge.dot(move)) || 1);
    const offRad = Math.atan2(edge.clone().cross(move).dot(UP), edge.dot(move));
    this.turn(UP, offRad * Math.min(1, move.length() / (COMES_ROUND * this.sceneSizeM)));
    this.moveBy(move);
  }

  private turn(axis: Vector3, angleRad: number): void {
    this.wanted.turn.premultiply(new Quaternion().setFromAxisAngle(axis, angleRad)).normalize();
  }
}

function screenUp(camera: Camera): Vector3 {
  return new Vector3(0, 1, 0).applyQuaternion(camera.quaternion);
}

/** A drag moves in the upright plane that faces the camera; seen from above, over the table. */
function workingAxes(camera: Camera): WorkingAxes {
  const right = new Vector3(1, 0, 0).applyQuaternion(camera.quaternion);
  const forward = new Vector3(0, 0, -1).applyQuaternion(camera.quaternion);
  const level = new Vector3().crossVectors(UP, right).normalize();
  const isSteep = Math.asin(Math.min(1, -forward.y)) > STEEP_RAD;
  return isSteep
    ? { right, up: level, away: UP.clone().negate(), level }
    : { right, up: UP.clone(), away: level, level };
}
