import { create, type MessageInitShape } from "@bufbuild/protobuf";
import { Box3, type BufferGeometry, Mesh, type Object3D, Quaternion, Vector3 } from "three";
import { describe, expect, test } from "vitest";
import { ToolSummarySchema } from "../src/gen/kerf/v1/types_pb";
import type { ToolFrame, Vector } from "../src/net/frames";
import { NeckLength } from "../src/scene/neck";
import { type ToolShape, toolShape } from "../src/scene/tool-shapes";

const BOX = new Box3(new Vector3(-0.06, 0, -0.06), new Vector3(0.06, 0.1, 0.06));
const SIZE_M = 0.2;
const STEP_M = 0.005;

/** Vertices all over the box's skin. */
function skin({ min, max }: Box3): Float32Array {
  const positions: number[] = [];
  const counts = max.clone().sub(min).divideScalar(STEP_M).round();
  for (let i = 0; i <= counts.x; i++) {
    for (let j = 0; j <= counts.y; j++) {
      for (let k = 0; k <= counts.z; k++) {
        const isOnSkin = i % counts.x === 0 || j % counts.y === 0 || k % counts.z === 0;
        if (isOnSkin) positions.push(min.x + i * STEP_M, min.y + j * STEP_M, min.z + k * STEP_M);
      }
    }
  }
  return Float32Array.from(positions);
}

const TISSUE = [skin(BOX)];
const EDGE_OF_FOLDS = [-0.02, 0, 0.006, -0.01, 0, -0.006, 0, 0, 0.006, 0.01, 0, -0.006, 0.02, 0, 0.006];
const KINDS: Record<string, MessageInitShape<typeof ToolSummarySchema>> = {
  blade: { kind: { case: "blade", value: { widthM: 0.04, heightM: 0.03, thicknessM: 0.001 } } },
  "folded blade": { kind: { case: "blade", value: { widthM: 0.04, heightM: 0.03, edgeM: EDGE_OF_FOLDS } } },
  scissors: { kind: { case: "scissors", value: { bladeLengthM: 0.03, bladeHeightM: 0.005, maxAngleRad: 1 } } },
  grasper: { kind: { case: "grasper", value: { radiusM: 0.004 } } },
  probe: { kind: { case: "probe", value: { radiusM: 0.004, lengthM: 0.01 } } },
};

const shapeOf = (kind: string) => toolShape(create(ToolSummarySchema, KINDS[kind]).kind);

/** Turns what the neck goes along upwards, and tips it. */
function upright({ neck }: ToolShape, tipRad: number): Quaternion {
  const turn = new Quaternion().setFromUnitVectors(neck.along, new Vector3(0, 1, 0));
  return turn.premultiply(new Quaternion().setFromAxisAngle(new Vector3(0, 0, 1), tipRad));
}

function frame(at: Vector3, turn: Quaternion, forceN: Vector): ToolFrame {
  const pose = { position: at.toArray(), orientation: turn.toArray() };
  return { pose, forceN, cuttingLengthM: 0, opening: 1, isHolding: false };
}

/** Puts it there, with the neck that it has in its first picture. */
function put(shape: ToolShape, at: Vector3, turn: Quaternion, forceN: Vector): void {
  shape.setNeck(new NeckLength(shape.neck, SIZE_M).follow(frame(at, turn, forceN), 0, TISSUE));
  shape.object.position.copy(at);
  shape.object.quaternion.copy(turn);
}

/** Vertices of the parts of a name, m. */
function verticesOf({ object }: ToolShape, name: string): Vector3[] {
  object.updateMatrixWorld(true);
  const vertices: Vector3[] = [];
  const take = (mesh: Object3D) => {
    if (!(mesh instanceof Mesh)) return;
    const { position } = (mesh.geometry as BufferGeometry).attributes;
    for (let i = 0; i < position.count; i++) {
      vertices.push(new Vector3().fromBufferAttribute(position, i).applyMatrix4(mesh.matrixWorld));
    }
  };
  object.traverse((part) => part.name === name && part.traverse(take));
  return vertices;
}

const isIn = (vertex: Vector3) => BOX.containsPoint(vertex);

describe.each(Object.keys(KINDS))("a %s", (kind) => {
  test.each([0, 0.4])("deep in tissue, tipped by %f rad, has its grip outside", (tipRad) => {
    const shape = shapeOf(kind);
    const turn = upright(shape, tipRad);
    const foot = new Vector3(0.005, 0.03, 0.005);
    put(shape, foot.clone().sub(shape.neck.foot.clone().applyQuaternion(turn)), turn, [0, 1, 0]);
    for (const opening of [0, 1]) {
      shape.setOpening(opening);
      expect(verticesOf(shape, "grip").filter(isIn)).toEqual([]);
    }
    const neck = verticesOf(shape, "neck");
    expect(neck.some(isIn)).toBe(true);
    expect(neck.some((vertex) => !isIn(vertex))).toBe(true);
  });

  test("in the air, over the tissue or under it, has the neck that it is made with", () => {
    const made = [...verticesOf(shapeOf(kind), "grip"), ...verticesOf(shapeOf(kind), "neck")];
    for (const at of [new Vector3(0, 0.15, 0), new Vector3(0, -0.1, 0)]) {
      const shape = shapeOf(kind);
      put(shape, at, new Quaternion(), [0, 0, 0]);
      const now = [...verticesOf(shape, "grip"), ...verticesOf(shape, "neck")];
      now.forEach((vertex, i) => expect(vertex.distanceTo(made[i].clone().add(at))).toBeLessThan(1e-7));
    }
  });
});

test.each(["blade", "folded blade", "scissors"])("the neck of a %s stands in its cut", (kind) => {
  const shape = shapeOf(kind);
  shape.setNeck(0.1);
  const neck = verticesOf(shape, "neck");
  const extent = (axis: "x" | "y" | "z") => {
    const values = neck.map((vertex) => vertex[axis]);
    return Math.max(...values) - Math.min(...values);
  };
  if (kind === "scissors") {
    // As thick as it is drawn, and as the two halves are high at most.
    expect(extent("z")).toBeCloseTo(0.018 * 0.005, 6);
    expect(extent("y")).toBeLessThan(2 * 0.005);
    return;
  }
  expect(extent("x")).toBeGreaterThan(0);
  expect(extent("x")).toBeLessThan(0.04);
  // The edge's height over its width, whose halves are folded the other way round.
  const foldM = (x: number) => (kind === "blade" ? 0 : 0.006 - 0.012 * (Math.abs(x) / 0.01));
  const thicknessM = kind === "blade" ? 0.001 : 0.018 * 0.03;
  for (const { x, z } of neck) expect(Math.abs(z - foldM(x))).toBeLessThan(thicknessM / 2 + 1e-7);
});

describe("the neck of a blade", () => {
  const turn = new Quaternion();
  /** Lengths at 60 pictures a second, at heights of the edge. */
  const lengths = (shape: ToolShape, heightsM: number[], x: (i: number) => number = () => 0) => {
    const neck = new NeckLength(shape.neck, SIZE_M);
    return heightsM.map((y, i) => neck.follow(frame(new Vector3(x(i), y, 0), turn, [0, 1, 0]), i / 60, TISSUE));
  };

  test("keeps the grip out while it plunges, and is short again when it is out", () => {
    const shape = shapeOf("blade");
    const spineM = shape.neck.foot.y;
    const down = Array.from({ length: 30 }, (_, i) => 0.11 - i * 0.0036);
    const up = [...down].reverse();
    const heightsM = [...down, ...up, ...Array<number>(60).fill(0.11)];
    const found = lengths(shape, heightsM);
    found.forEach((lengthM, i) => expect(heightsM[i] + spineM + lengthM).toBeGreaterThan(0.1));
    for (let i = 1; i < found.length; i++) expect(Math.abs(found[i] - found[i - 1])).toBeLessThan(0.005);
    expect(found.at(-1)).toBeCloseTo(shape.neck.leastM, 4);
  });

  test("grows from picture to picture where the tool comes into tissue from the side", () => {
    const shape = shapeOf("blade");
    // From 20 mm beside the box, whose top is 60 mm over the spine.
    const found = lengths(shape, Array<number>(40).fill(0.01), (i) => (i === 0 ? -0.09 : -0.05));
    const wantedM = found.at(-1)!;
    expect(found[0]).toBe(shape.neck.leastM);
    expect(wantedM).toBeGreaterThan(0.06);
    for (let i = 1; i < found.length; i++) expect(found[i] - found[i - 1]).toBeLessThan(0.25 * (wantedM - found[0]));
    expect(found[14]).toBeGreaterThan(0.9 * wantedM);
  });

  test("is at once as long as it has to be in the first picture, and after the session went back", () => {
    const shape = shapeOf("blade");
    const neck = new NeckLength(shape.neck, SIZE_M);
    const at = (y: number, timeS: number) => neck.follow(frame(new Vector3(0, y, 0), turn, [0, 1, 0]), timeS, TISSUE);
    const deepM = at(0.01, 5);
    expect(deepM).toBeGreaterThan(0.06);
    expect(at(0.2, 1)).toBe(shape.neck.leastM);
    expect(at(0.01, 0)).toBe(deepM);
  });
});
