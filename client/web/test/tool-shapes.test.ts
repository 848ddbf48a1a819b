import { create } from "@bufbuild/protobuf";
import { Box3 } from "three";
import { expect, test } from "vitest";
import { ToolSummarySchema } from "../src/gen/kerf/v1/types_pb";
import { plate, toolShape } from "../src/scene/tool-shapes";

test("a blade is as thick as it is stated, and folded as its edge is", () => {
  const edge = [[-0.02, 0, 0.01], [0, 0.002, -0.01], [0.02, 0, 0.01]] as const;
  const { position } = plate(edge, 0.05, 0.004).attributes;
  const at = (x: number) => {
    const points = Array.from({ length: position.count }, (_, i) => [position.getX(i), position.getY(i), position.getZ(i)]);
    return points.filter((point) => Math.abs(point[0] - x) < 1e-9);
  };
  for (const [x, y, z] of edge) {
    const points = at(x);
    const zs = points.map((point) => point[2]);
    expect(Math.max(...zs)).toBeCloseTo(z + 0.002, 6);
    expect(Math.min(...zs)).toBeCloseTo(z - 0.002, 6);
    const lowest = points.reduce((low, point) => (point[1] < low[1] ? point : low));
    expect(lowest[1]).toBeCloseTo(y, 6);
    expect(lowest[2]).toBeCloseTo(z, 6);
    expect(Math.max(...points.map((point) => point[1]))).toBeCloseTo(0.052, 6);
  }
});

const HANDLE = { radiusM: 0.005, lengthM: 0.1 };

test.each([
  [{ case: "blade", value: { widthM: 0.04, heightM: 0.03, handle: HANDLE } }, [-0.005, 0.03, 0.005, 0.14]],
  [{ case: "grasper", value: { radiusM: 0.004, handle: HANDLE } }, [-0.005, 0.012, 0.005, 0.122]],
  [{ case: "scissors", value: { bladeLengthM: 0.04, bladeHeightM: 0.01, handle: HANDLE } }, [-0.11, -0.005, 0, 0.005]],
] as const)("a handle that touches is drawn where it is, and goes out of no tissue: %o", (kind, box) => {
  const shape = toolShape(create(ToolSummarySchema, { kind }).kind);
  shape.setNeck(1);
  shape.setOpening(0.5);
  const grip = shape.object.getObjectByName("grip");
  const { min, max } = new Box3().setFromObject(grip!);
  [min.x, min.y, max.x, max.y].forEach((at, i) => {
    expect(at).toBeCloseTo(box[i], 4);
  });
});
