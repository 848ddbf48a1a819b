// The picture of a session: its tissue, its tools, and the table they stand on.

import { Box3, Quaternion, Raycaster, Vector2, Vector3 } from "three";
import type { SurfaceShape } from "./decode/surface";
import type { SceneSummary, Vec3 } from "./gen/kerf/v1/types_pb";
import type { GetInteriorResponse } from "./gen/kerf/v1/view_pb";
import type { DrivenPose } from "./net/hands-messages";
import type { Frame } from "./net/frames";
import { Interior } from "./scene/interior";
import type { Stage } from "./scene/stage";
import { type Style, Tissue } from "./scene/tissue";
import { Tool } from "./scene/tools";
import { hideLegend, showLegend } from "./ui/legend";

/** Clear air between the tissue and a tool that is put down over it, in sizes of the scene. */
const CLEARANCE = 0.03;
/** Half the width of the strip under an edge that a tool is put down over, in sizes of the scene. */
const STRIP = 0.03;
/** Edges point away from whoever looks, so that a cut opens to both sides. */
const FIRST_TURN = new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), Math.PI / 2);

export class SessionPicture {
  readonly tools: Tool[];
  readonly sizeM: number;
  private readonly stage: Stage;
  private readonly tissues: Tissue[];
  private readonly interiors: Interior[];
  private shownStyle: Style = "tissue";
  private readonly bounds = new Box3();
  private readonly pieces: number[] = [];
  /** The largest force that was shown, N: the longest arrow. */
  private fullForceN = 1e-3;
  /** Where the tools were last seen. */
  private seenTools = "";

  constructor(stage: Stage, scene: SceneSummary) {
    this.stage = stage;
    for (const { restMinM, restMaxM } of scene.objects) {
      this.bounds.union(new Box3(vector(restMinM), vector(restMaxM)));
    }
    this.sizeM = this.bounds.getSize(new Vector3()).length();
    this.tissues = scene.objects.map(({ name, materialNames, materialColors, restMinM, restMaxM }) => {
      return new Tissue(name, materialNames, materialColors, vector(restMinM).distanceTo(vector(restMaxM)));
    });
    this.interiors = scene.objects.map(() => new Interior());
    this.tools = scene.tools.map((summary) => new Tool(summary, this.sizeM));
    stage.scene.add(...this.tissues, ...this.interiors, ...this.tools.map(({ group }) => group));
    stage.frame(this.bounds);
  }

  get cutAreaM2(): number {
    return this.tissues.reduce((sum, tissue) => sum + tissue.cutAreaM2, 0);
  }

  get pieceCount(): number {
    return this.pieces.reduce((sum, pieces) => sum + pieces, 0);
  }

  set style(style: Style) {
    this.shownStyle = style;
    for (const tissue of this.tissues) tissue.style = style;
    // What is shown next comes with the next answer.
    for (const interior of this.interiors) interior.dispose();
    if (style !== "voxels" && style !== "links") hideLegend();
    this.stage.invalidate();
  }

  /** Whether forces are drawn; an arrow that is shown again comes with the next frame. */
  set showsForces(shown: boolean) {
    for (const tool of this.tools) tool.showsForce = shown;
    this.stage.invalidate();
  }

  /** Takes a frame over; answers with arrays that are shown no more. */
  show(frame: Frame): SurfaceShape[] {
    const used = frame.bodies.map((body, index) => {
      if (body.structure) this.pieces[index] = body.structure.pieces;
      return this.tissues[index].show(body, frame.simTimeS);
    });
    const newest = frame.samples.at(-1);
    const positions = this.tissues.map((tissue) => tissue.positions);
    newest?.tools.forEach((tool, index) => {
      this.fullForceN = Math.max(this.fullForceN, Math.hypot(...tool.forceN));
      this.tools[index].keepClear(tool, frame.simTimeS, positions);
      this.tools[index].show(tool, this.fullForceN);
    });
    this.refresh();
    // One entry per object, or none: the first frame has no forerunner.
    return used.includes(undefined) ? [] : (used as SurfaceShape[]);
  }

  showInterior(object: number, told: GetInteriorResponse): void {
    if (this.shownStyle !== "voxels" && this.shownStyle !== "links") return;
    this.interiors[object].show(told, this.shownStyle);
    showLegend(this.interiors.map(({ mostJPerM3 }) => mostJPerM3));
    this.stage.invalidate();
  }

  showHand(toolId: number, wanted: DrivenPose | undefined): void {
    this.tools[toolId].showHand(wanted);
    this.refresh();
  }

  /** Has the picture drawn anew if it looks other than it did: tissue that sleeps costs a viewer nothing. */
  private refresh(): void {
    const seenTools = this.tools.map(({ seen }) => seen).join();
    if (seenTools === this.seenTools && !this.tissues.some(({ looksNew }) => looksNew)) return;
    this.seenTools = seenTools;
    this.stage.invalidate();
  }

  /** The tissue under a point of the canvas, in shares of its size from its lower left corner, -1 to 1. */
  pick(x: number, y: number): Vector3 | undefined {
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2(x, y), this.stage.camera);
    const meshes = this.tissues.flatMap((tissue) => tissue.meshes);
    // It was of where the tissue was when somebody picked last.
    for (const { geometry } of meshes) geometry.boundingSphere = null;
    return ray.intersectObjects(meshes, false)[0]?.point;
  }

  /** A place in the air over a point of the tissue, or over its middle, where a tool touches nothing. */
  placeOver(toolId: number, point = this.bounds.getCenter(new Vector3())): { position: Vector3; turn: Quaternion } {
    const { shape } = this.tools[toolId];
    const halfM = Math.max(0.5 * shape.sizeM, STRIP * this.sizeM);
    let topM = Number.NEGATIVE_INFINITY;
    for (const { positions } of this.tissues) {
      for (let i = 0; i < positions.length; i += 3) {
        const isUnder = Math.abs(positions[i] - point.x) < halfM && Math.abs(positions[i + 2] - point.z) < halfM;
        if (isUnder) topM = Math.max(topM, positions[i + 1]);
      }
    }
    if (topM === Number.NEGATIVE_INFINITY) topM = this.bounds.max.y;
    const clearM = CLEARANCE * this.sizeM + (shape.hasJaws ? 0.4 * shape.sizeM : 0);
    return { position: new Vector3(point.x, topM + clearM, point.z), turn: FIRST_TURN.clone() };
  }

  /** What a file of the tissue holds. */
  get exported(): Tissue[] {
    return this.tissues;
  }

  dispose(): void {
    hideLegend();
    for (const part of [...this.tissues, ...this.interiors]) part.dispose();
    this.stage.scene.remove(...this.tissues, ...this.interiors, ...this.tools.map(({ group }) => group));
  }
}

function vector(from: Vec3 | undefined): Vector3 {
  return new Vector3(from?.x, from?.y, from?.z);
}
