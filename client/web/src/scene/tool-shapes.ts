// Tools as they are drawn, in the tool frame: +x along the edge, -y the cutting direction, +z the blade's normal.

import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CapsuleGeometry,
  CylinderGeometry,
  Group,
  Mesh,
  MeshPhysicalMaterial,
  MeshStandardMaterial,
  type Object3D,
  TorusGeometry,
  Vector3,
} from "three";
import type { BladeSummary, GrasperSummary, ProbeSummary, ScissorsSummary, ToolSummary } from "../gen/kerf/v1/types_pb";
import type { Neck } from "./neck";

const STEEL = new MeshPhysicalMaterial({ color: 0xc4ccd6, metalness: 0.6, roughness: 0.32, side: 2 });
const GRIP = new MeshStandardMaterial({ color: 0x39414b, roughness: 0.5, metalness: 0.3 });

/** A blade without thickness is drawn this thick, as a share of its height. */
const LEAST_THICKNESS = 0.018;
/** Closed scissors have crossed by this angle, rad. */
const CROSSED_RAD = 0.1;

/** A tool as it is drawn. */
export interface ToolShape {
  object: Object3D;
  /** Size of the tool, m. */
  sizeM: number;
  hasJaws: boolean;
  neck: Neck;
  setOpening(opening: number): void;
  setNeck(lengthM: number): void;
}

const WITHOUT_JAWS = { hasJaws: false, setOpening() {} };
const UPWARDS = new Vector3(0, 1, 0);

export function toolShape(kind: ToolSummary["kind"]): ToolShape {
  switch (kind.case) {
    case "blade":
      return blade(kind.value);
    case "scissors":
      return scissors(kind.value);
    case "grasper":
      return grasper(kind.value);
    case "probe":
      return probe(kind.value);
    default:
      return unknown();
  }
}

/** What has no picture. */
function unknown(): ToolShape {
  const neck = { foot: new Vector3(), along: UPWARDS, leastM: 0, reachM: 0 };
  return { object: new Group(), sizeM: 0.01, neck, ...WITHOUT_JAWS, setNeck() {} };
}

function blade({ widthM, heightM, thicknessM, edgeM, handle }: BladeSummary): ToolShape {
  const points: Point[] = [];
  for (let i = 0; i < edgeM.length; i += 3) points.push([edgeM[i], edgeM[i + 1], edgeM[i + 2]]);
  if (points.length < 2) points.push([-widthM / 2, 0, 0], [widthM / 2, 0, 0]);
  const spineM = topOf(points, heightM);
  const object = new Group();
  object.add(steel(plate(points, heightM, thicknessM)));
  const sizeM = Math.max(widthM, heightM);
  if (handle) {
    const { part, ...its } = touching(handle, new Vector3(0, spineM, 0), UPWARDS);
    object.add(part);
    return { object: shadowed(object), sizeM, ...WITHOUT_JAWS, ...its };
  }
  const gripM = Math.min(0.16 * widthM, 0.3 * heightM);
  const { middle, part } = middleOf(points, 0.7 * gripM);
  const foot = new Vector3(middle[0], spineM, middle[2]);
  // It goes on from the spine, folded as that is: it stands in the cut of the blade.
  const shaft = steel(band(part, drawnThickness(thicknessM, heightM)));
  shaft.position.y = spineM;
  const grip = capsule(gripM / 2, 0.9 * heightM);
  object.add(named("neck", shaft), named("grip", grip));
  const setNeck = (lengthM: number) => {
    shaft.scale.y = lengthM;
    grip.position.copy(foot).addScaledVector(UPWARDS, lengthM);
  };
  const neck = { foot, along: UPWARDS, leastM: 0.2 * heightM, reachM: gripM / 2 };
  setNeck(neck.leastM);
  return { object: shadowed(object), sizeM, neck, ...WITHOUT_JAWS, setNeck };
}

/** A handle on which tissue presses: it is drawn where it is, in tissue too. */
function touching({ radiusM, lengthM }: ProbeSummary, foot: Vector3, along: Vector3) {
  const grip = capsule(radiusM, lengthM);
  grip.position.copy(foot);
  grip.quaternion.setFromUnitVectors(UPWARDS, along);
  return { part: named("grip", grip), neck: { foot, along, leastM: 0, reachM: radiusM }, setNeck() {} };
}

/** A handle that stands on its foot. */
function capsule(radiusM: number, lengthM: number): Mesh {
  const geometry = new CapsuleGeometry(radiusM, lengthM, 6, 20);
  return new Mesh(geometry.translate(0, lengthM / 2 + radiusM, 0), GRIP);
}

function scissors({ bladeLengthM, bladeHeightM, maxAngleRad, thicknessM, handle }: ScissorsSummary): ToolShape {
  const edge: Point[] = [[0, 0, 0], [bladeLengthM, 0, 0]];
  const flanks = halves(() => steel(plate(edge, bladeHeightM, thicknessM)));
  const pairs = [flanks];
  const setOpening = (opening: number) => {
    const halfRad = 0.5 * (opening * (maxAngleRad + CROSSED_RAD) - CROSSED_RAD);
    for (const [upper, lower] of pairs) {
      upper.rotation.z = halfRad;
      lower.rotation.z = -halfRad;
    }
  };
  const its = { sizeM: bladeLengthM, hasJaws: true, setOpening };
  const backwards = new Vector3(-1, 0, 0);
  const object = new Group();
  object.add(...flanks);
  if (handle) {
    const { part, ...others } = touching(handle, new Vector3(), backwards);
    object.add(part);
    setOpening(1);
    return { object: shadowed(object), ...its, ...others };
  }
  const handles = halves(() => named("grip", scissorsHandle(bladeLengthM)));
  pairs.push(handles);
  // Long scissors turn their handles at the other end of a bar, which lies in the plane that they cut.
  const barM = Math.min(0.08 * bladeLengthM, bladeHeightM);
  const bar = steel(new BoxGeometry(1, barM, drawnThickness(thicknessM, bladeHeightM)).translate(-0.5, 0, 0));
  const setNeck = (lengthM: number) => {
    bar.visible = lengthM > 0;
    bar.scale.x = lengthM;
    for (const handle of handles) handle.position.x = -lengthM;
  };
  const neck = { foot: new Vector3(), along: backwards, leastM: 0, reachM: 0.31 * bladeLengthM };
  setOpening(1);
  setNeck(neck.leastM);
  object.add(...handles, named("neck", bar));
  return { object: shadowed(object), ...its, neck, setNeck };
}

/** The upper half of something and its mirror image, the lower one. */
function halves(make: () => Object3D): [Group, Group] {
  const half = (side: 1 | -1) => {
    const group = new Group();
    group.add(make());
    group.scale.y = side;
    return group;
  };
  return [half(1), half(-1)];
}

/** A shank, and a ring for a finger at its end. */
function scissorsHandle(bladeLengthM: number): Group {
  const handle = new Group();
  const ring = new Mesh(new TorusGeometry(0.16 * bladeLengthM, 0.03 * bladeLengthM, 12, 32), GRIP);
  const shankM = 0.9 * bladeLengthM;
  const shank = steel(new CylinderGeometry(0.03 * bladeLengthM, 0.05 * bladeLengthM, shankM, 12));
  shank.rotation.z = Math.PI / 2;
  shank.position.set(-shankM / 2, -0.06 * bladeLengthM, 0);
  ring.position.set(-shankM - 0.14 * bladeLengthM, -0.12 * bladeLengthM, 0);
  handle.add(shank, ring);
  return handle;
}

function grasper({ radiusM, handle }: GrasperSummary): ToolShape {
  const object = new Group();
  const pivotM = 3 * radiusM;
  const jaw = (side: 1 | -1) => {
    const pivot = new Group();
    pivot.position.y = pivotM;
    const finger = steel(new CapsuleGeometry(0.28 * radiusM, 3 * radiusM, 6, 16));
    finger.position.set(side * 0.22 * radiusM, -1.7 * radiusM, 0);
    finger.scale.z = 1.5;
    pivot.add(finger);
    object.add(pivot);
    return pivot;
  };
  const [left, right] = [jaw(-1), jaw(1)];
  const setOpening = (opening: number) => {
    left.rotation.z = -0.42 * opening;
    right.rotation.z = 0.42 * opening;
  };
  setOpening(1);
  const behind = handle ? touching(handle, new Vector3(0, pivotM, 0), UPWARDS) : rod(0.42 * radiusM, pivotM, 10 * radiusM);
  const { part, ...its } = behind;
  object.add(part);
  return { object: shadowed(object), sizeM: 4 * radiusM, hasJaws: true, setOpening, ...its };
}

function probe({ radiusM, lengthM }: ProbeSummary): ToolShape {
  const object = new Group();
  const tip = steel(new CapsuleGeometry(radiusM, lengthM, 12, 32));
  tip.rotation.z = Math.PI / 2;
  const { part, ...its } = rod(0.3 * radiusM, 0.8 * radiusM, 8 * radiusM);
  object.add(tip, part);
  return { object: shadowed(object), sizeM: 2 * radiusM + lengthM, ...WITHOUT_JAWS, ...its };
}

/** A shaft of a tool without a grip, whose upper end is to be seen. */
function rod(radiusM: number, footM: number, leastM: number) {
  const shaft = steel(new CylinderGeometry(radiusM, radiusM, 1, 20).translate(0, 0.5, 0));
  shaft.position.y = footM;
  const setNeck = (lengthM: number) => {
    shaft.scale.y = lengthM;
  };
  setNeck(leastM);
  const neck = { foot: shaft.position.clone(), along: UPWARDS, leastM, reachM: radiusM };
  return { part: named("neck", shaft), neck, setNeck };
}

type Point = readonly [number, number, number];

function topOf(edge: readonly Point[], heightM: number): number {
  return Math.max(...edge.map(([, y]) => y)) + heightM;
}

function drawnThickness(thicknessM: number, heightM: number): number {
  return Math.max(thicknessM, LEAST_THICKNESS * heightM);
}

/** A piece of steel as the edge sweeps it upwards, folded where the edge is, and ground to it. */
export function plate(edge: readonly Point[], heightM: number, thicknessM: number): BufferGeometry {
  const halfM = 0.5 * drawnThickness(thicknessM, heightM);
  const groundM = 0.14 * heightM;
  const topM = topOf(edge, heightM);
  // From one flank over the edge to the other.
  return loft(
    edge.map(([x, y, z]) => [
      [x, topM, z + halfM],
      [x, y + groundM, z + halfM],
      [x, y, z],
      [x, y + groundM, z - halfM],
      [x, topM, z - halfM],
    ]),
  );
}

/** A strip along an edge, from height 0 to 1. */
function band(edge: readonly Point[], thicknessM: number): BufferGeometry {
  const halfM = 0.5 * thicknessM;
  return loft(
    edge.map(([x, , z]) => [
      [x, 1, z + halfM],
      [x, 0, z + halfM],
      [x, 0, z - halfM],
      [x, 1, z - halfM],
    ]),
  );
}

/** A body between profiles that follow one another, each a ring of as many points. */
function loft(profiles: readonly (readonly Point[])[]): BufferGeometry {
  const positions: number[] = [];
  const count = profiles[0].length;
  for (let i = 0; i + 1 < profiles.length; i++) {
    for (let k = 0; k < count; k++) {
      const next = (k + 1) % count;
      const [a, b, c, d] = [profiles[i][k], profiles[i][next], profiles[i + 1][next], profiles[i + 1][k]];
      positions.push(...a, ...b, ...c, ...a, ...c, ...d);
    }
  }
  for (const end of [profiles[0], profiles[profiles.length - 1]]) {
    for (let k = 1; k + 1 < count; k++) positions.push(...end[0], ...end[k], ...end[k + 1]);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.computeVertexNormals();
  return geometry;
}

/** The middle of an edge, and so much of its length to both sides of that. */
function middleOf(edge: readonly Point[], lengthM: number): { middle: Point; part: Point[] } {
  const waysM = [0];
  for (let i = 1; i < edge.length; i++) {
    waysM.push(waysM[i - 1] + new Vector3(...edge[i]).distanceTo(new Vector3(...edge[i - 1])));
  }
  const at = (wayM: number): Point => {
    const next = Math.max(1, waysM.findIndex((sinceM) => sinceM >= wayM));
    const share = (wayM - waysM[next - 1]) / (waysM[next] - waysM[next - 1]);
    return new Vector3(...edge[next - 1]).lerp(new Vector3(...edge[next]), share).toArray();
  };
  const middleM = waysM[edge.length - 1] / 2;
  const halfM = Math.min(lengthM / 2, middleM);
  const inner = edge.filter((_, i) => Math.abs(waysM[i] - middleM) < halfM);
  return { middle: at(middleM), part: [at(middleM - halfM), ...inner, at(middleM + halfM)] };
}

function steel(geometry: BufferGeometry): Mesh {
  return new Mesh(geometry, STEEL);
}

function named<T extends Object3D>(name: string, part: T): T {
  part.name = name;
  return part;
}

function shadowed(object: Object3D): Object3D {
  object.traverse((part) => {
    part.castShadow = true;
    part.receiveShadow = true;
  });
  return object;
}
