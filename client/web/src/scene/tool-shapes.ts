// Tools as they are drawn, in the tool frame: +x along the edge, -y the cutting direction, +z the blade's normal.

import {
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
} from "three";
import type { BladeSummary, GrasperSummary, ProbeSummary, ScissorsSummary, ToolSummary } from "../gen/kerf/v1/types_pb";

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
  setOpening(opening: number): void;
}

const fixed = (object: Object3D, sizeM: number): ToolShape => ({ object, sizeM, hasJaws: false, setOpening() {} });

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
      return fixed(new Group(), 0.01);
  }
}

function blade({ widthM, heightM, thicknessM, edgeM }: BladeSummary): ToolShape {
  const points: Point[] = [];
  for (let i = 0; i < edgeM.length; i += 3) points.push([edgeM[i], edgeM[i + 1], edgeM[i + 2]]);
  if (points.length < 2) points.push([-widthM / 2, 0, 0], [widthM / 2, 0, 0]);
  const object = new Group();
  object.add(steel(plate(points, heightM, thicknessM)));
  const gripM = Math.min(0.16 * widthM, 0.3 * heightM);
  const grip = new Mesh(new CapsuleGeometry(gripM / 2, 0.9 * heightM, 6, 20), GRIP);
  grip.position.y = heightM + 0.42 * heightM;
  object.add(grip);
  return fixed(shadowed(object), Math.max(widthM, heightM));
}

function scissors({ bladeLengthM, bladeHeightM, maxAngleRad, thicknessM }: ScissorsSummary): ToolShape {
  const object = new Group();
  const half = (side: 1 | -1) => {
    const arm = new Group();
    const edge: Point[] = [[0, 0, 0], [bladeLengthM, 0, 0]];
    const flank = steel(plate(edge, bladeHeightM, thicknessM));
    const ring = new Mesh(new TorusGeometry(0.16 * bladeLengthM, 0.03 * bladeLengthM, 12, 32), GRIP);
    const shankM = 0.9 * bladeLengthM;
    const shank = steel(new CylinderGeometry(0.03 * bladeLengthM, 0.05 * bladeLengthM, shankM, 12));
    shank.rotation.z = Math.PI / 2;
    shank.position.set(-shankM / 2, -0.06 * bladeLengthM, 0);
    ring.position.set(-shankM - 0.14 * bladeLengthM, -0.12 * bladeLengthM, 0);
    arm.add(flank, shank, ring);
    // The lower blade is the upper one's mirror image.
    arm.scale.y = side;
    object.add(arm);
    return arm;
  };
  const [upper, lower] = [half(1), half(-1)];
  const setOpening = (opening: number) => {
    const halfRad = 0.5 * (opening * (maxAngleRad + CROSSED_RAD) - CROSSED_RAD);
    upper.rotation.z = halfRad;
    lower.rotation.z = -halfRad;
  };
  setOpening(1);
  return { object: shadowed(object), sizeM: bladeLengthM, hasJaws: true, setOpening };
}

function grasper({ radiusM }: GrasperSummary): ToolShape {
  const object = new Group();
  const jaw = (side: 1 | -1) => {
    const pivot = new Group();
    pivot.position.y = 3 * radiusM;
    const finger = steel(new CapsuleGeometry(0.28 * radiusM, 3 * radiusM, 6, 16));
    finger.position.set(side * 0.22 * radiusM, -1.7 * radiusM, 0);
    finger.scale.z = 1.5;
    pivot.add(finger);
    object.add(pivot);
    return pivot;
  };
  const [left, right] = [jaw(-1), jaw(1)];
  const shaft = steel(new CylinderGeometry(0.42 * radiusM, 0.42 * radiusM, 10 * radiusM, 20));
  shaft.position.y = 8 * radiusM;
  object.add(shaft);
  const setOpening = (opening: number) => {
    left.rotation.z = -0.42 * opening;
    right.rotation.z = 0.42 * opening;
  };
  setOpening(1);
  return { object: shadowed(object), sizeM: 4 * radiusM, hasJaws: true, setOpening };
}

function probe({ radiusM, lengthM }: ProbeSummary): ToolShape {
  const object = new Group();
  const tip = steel(new CapsuleGeometry(radiusM, lengthM, 12, 32));
  tip.rotation.z = Math.PI / 2;
  const shaft = steel(new CylinderGeometry(0.3 * radiusM, 0.3 * radiusM, 8 * radiusM, 16));
  shaft.position.y = 4.8 * radiusM;
  object.add(tip, shaft);
  return fixed(shadowed(object), 2 * radiusM + lengthM);
}

type Point = readonly [number, number, number];

/** A piece of steel as the edge sweeps it upwards, folded where the edge is, and ground to it. */
export function plate(edge: readonly Point[], heightM: number, thicknessM: number): BufferGeometry {
  const halfM = 0.5 * Math.max(thicknessM, LEAST_THICKNESS * heightM);
  const groundM = 0.14 * heightM;
  const topM = Math.max(...edge.map(([, y]) => y)) + heightM;
  // From one flank over the edge to the other.
  const profile = edge.map(([x, y, z]) => [
    [x, topM, z + halfM],
    [x, y + groundM, z + halfM],
    [x, y, z],
    [x, y + groundM, z - halfM],
    [x, topM, z - halfM],
  ]);
  const positions: number[] = [];
  for (let i = 0; i + 1 < profile.length; i++) {
    for (let k = 0; k < 5; k++) {
      const next = (k + 1) % 5;
      const [a, b, c, d] = [profile[i][k], profile[i][next], profile[i + 1][next], profile[i + 1][k]];
      positions.push(...a, ...b, ...c, ...a, ...c, ...d);
    }
  }
  for (const end of [profile[0], profile[profile.length - 1]]) {
    for (let k = 1; k + 1 < 5; k++) positions.push(...end[0], ...end[k], ...end[k + 1]);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.computeVertexNormals();
  return geometry;
}

function steel(geometry: BufferGeometry): Mesh {
  return new Mesh(geometry, STEEL);
}

function shadowed(object: Object3D): Object3D {
  object.traverse((part) => {
    part.castShadow = true;
    part.receiveShadow = true;
  });
  return object;
}
