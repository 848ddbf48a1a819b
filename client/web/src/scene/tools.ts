// The tools of a scene where the server has them, the force on each, and where a hand wants its own to be.

import { ConeGeometry, CylinderGeometry, Group, Mesh, MeshBasicMaterial, Quaternion, Vector3 } from "three";
import type { ToolSummary } from "../gen/kerf/v1/types_pb";
import type { DrivenPose } from "../net/hands-messages";
import type { ToolFrame } from "../net/frames";
import { NeckLength } from "./neck";
import { type ToolShape, toolShape } from "./tool-shapes";

const UP = new Vector3(0, 1, 0);
/** A hand that is this far ahead of its tool is shown, as a share of the tool's size. */
const SHOWN_LAG = 0.06;

/** One tool. */
export class Tool {
  readonly name: string;
  readonly shape: ToolShape;
  readonly group = new Group();
  private readonly ghost: ToolShape;
  private readonly arrow: ForceArrow;
  private readonly neck: NeckLength;
  /** Whether the force on it is drawn. */
  private hasArrow = true;

  constructor(summary: ToolSummary, sceneSizeM: number) {
    this.name = summary.name;
    this.shape = toolShape(summary.kind);
    this.ghost = toolShape(summary.kind);
    const mist = new MeshBasicMaterial({ color: 0x9fd8ff, transparent: true, opacity: 0.16, depthWrite: false });
    this.ghost.object.traverse((part) => {
      part.castShadow = part.receiveShadow = false;
      if (part instanceof Mesh) part.material = mist;
    });
    this.arrow = new ForceArrow(sceneSizeM);
    this.neck = new NeckLength(this.shape.neck, sceneSizeM);
    this.shape.object.visible = this.ghost.object.visible = false;
    this.group.add(this.shape.object, this.ghost.object, this.arrow.group);
  }

  /** Makes its neck as long as it has to be at a sim time, among tissues with these positions of vertices, m. */
  keepClear(tool: ToolFrame, timeS: number, tissues: readonly Float32Array[]): void {
    const lengthM = this.neck.follow(tool, timeS, tissues);
    this.shape.setNeck(lengthM);
    this.ghost.setNeck(lengthM);
  }

  /** Shows where it is, and the force on it as an arrow; the longest arrow stands for `fullForceN`. */
  show({ pose, forceN, opening }: ToolFrame, fullForceN: number): void {
    const { object } = this.shape;
    object.visible = pose !== undefined;
    this.arrow.group.visible = false;
    if (!pose) return;
    object.position.fromArray(pose.position);
    object.quaternion.fromArray(pose.orientation);
    this.shape.setOpening(opening);
    if (this.hasArrow) this.arrow.show(object.position, new Vector3(...forceN), fullForceN);
  }

  /** Where each of its parts is seen. */
  get seen(): string {
    const places: number[][] = [];
    this.group.traverseVisible(({ position, quaternion, scale }) => {
      places.push(position.toArray(), quaternion.toArray(), scale.toArray());
    });
    return JSON.stringify(places);
  }

  set showsForce(shown: boolean) {
    this.hasArrow = shown;
    if (!shown) this.arrow.group.visible = false;
  }

  /** Shows where its hand wants it to be, if that is elsewhere. */
  showHand(wanted: DrivenPose | undefined): void {
    const { object } = this.ghost;
    object.visible = false;
    if (!wanted) return;
    object.position.fromArray(wanted.position);
    object.quaternion.fromArray(wanted.orientation);
    this.ghost.setOpening(wanted.opening);
    const behindM = object.position.distanceTo(this.shape.object.position);
    object.visible = !this.shape.object.visible || behindM > SHOWN_LAG * this.shape.sizeM;
  }
}

/** The force on a tool. */
class ForceArrow {
  readonly group = new Group();
  private readonly shaft: Mesh;
  private readonly head: Mesh;
  private readonly longestM: number;

  constructor(sceneSizeM: number) {
    this.longestM = 0.3 * sceneSizeM;
    const radiusM = 0.008 * sceneSizeM;
    const material = new MeshBasicMaterial({ color: 0xffb454, toneMapped: false, depthTest: false, transparent: true });
    this.shaft = new Mesh(new CylinderGeometry(radiusM, radiusM, 1, 16).translate(0, 0.5, 0), material);
    this.head = new Mesh(new ConeGeometry(2.6 * radiusM, 6 * radiusM, 20).translate(0, 3 * radiusM, 0), material);
    this.group.add(this.shaft, this.head);
    this.group.visible = false;
  }

  show(at: Vector3, forceN: Vector3, fullForceN: number): void {
    const share = forceN.length() / fullForceN;
    // What cannot be told from nothing is not drawn.
    this.group.visible = share > 0.01;
    if (!this.group.visible) return;
    const lengthM = this.longestM * Math.min(1, share);
    this.group.position.copy(at);
    this.group.quaternion.copy(new Quaternion().setFromUnitVectors(UP, forceN.clone().normalize()));
    this.shaft.scale.set(1, lengthM, 1);
    this.head.position.y = lengthM;
  }
}
