import { create } from "@bufbuild/protobuf";
import { describe, expect, test } from "vitest";
import { ReplicaError } from "../src/decode/check";
import { decodeExactly } from "../src/decode/integers";
import { Replica } from "../src/decode/replica";
import { BodyStructureSchema, KeyframeSchema } from "../src/gen/kerf/v1/view_pb";
import { CORNERS, cube, cutPatch, integers, keyframe, quanta, QUANTUM_M, state, UNIT_CUBE } from "./messages";

/** The error that something is refused with. */
function refusal(act: () => void): ReplicaError {
  try {
    act();
  } catch (error) {
    if (error instanceof ReplicaError) return error;
    throw error;
  }
  throw new Error("nothing was refused");
}

function cubeReplica(): Replica {
  const replica = new Replica();
  replica.applyKeyframe(keyframe([cube()]));
  return replica;
}

describe("the surface hash", () => {
  test("is the one that a program that shares no line with this one computed from view.proto", () => {
    // The vector of tests/tests/surface_hash.rs.
    const ids = [3, 900, 4_000_000_000, 4_294_967_295];
    const body = create(BodyStructureSchema, {
      nodeCount: 8,
      nodeIds: CORNERS,
      nodeRestM: UNIT_CUBE,
      elementIds: [0, 1],
      elementNodes: [...CORNERS, ...CORNERS],
      vertexIds: ids,
      vertexElements: [0, 1, 1, 0],
      vertexLocal: [0, -0, 1, 0.1, 0.25, 0.7, 1, 0.5, 1e-30, 0.5, 0.5, 0.5],
      vertexMaterials: [0, 1, 65535, 0],
      heldVertexIds: [900, 4_294_967_295],
      heldVertexWeights: [0.1, 0, 0.7, 1e-30, 0, 0.025, 0, 0.25, 0, 0, 0, 0, 0, 0, 0, 0],
      quadIds: [1, 4_294_967_294],
      quadVertices: [...ids, ...ids.toReversed()],
      quantumM: QUANTUM_M,
    });
    const frame = create(KeyframeSchema, { bodies: [body, body], surfaceHash: 0x316d_de23_ada7_5291n });
    new Replica().applyKeyframe(frame);
    frame.surfaceHash ^= 1n;
    expect(refusal(() => new Replica().applyKeyframe(frame)).message).toContain("316dde23ada75291");
  });
});

describe("integers", () => {
  test("are read as the protocol's example has them", () => {
    // docs/reference/protocol.md, worked out by hand there.
    const values = [0, 0, 0, -1, 3, 150, 0];
    const bytes = Uint8Array.of(0x00, 0x02, 0x01, 0x06, 0xac, 0x02, 0x00, 0x00);
    expect(integers(values)).toEqual(bytes);
    const out = new Int32Array(7);
    decodeExactly("field", bytes, out);
    expect([...out]).toEqual(values);
    expect(() => decodeExactly("field", bytes, new Int32Array(6))).toThrow("more than 6");
    expect(() => decodeExactly("field", bytes, new Int32Array(8))).toThrow("7 entries");
    const large = new Float64Array(2);
    decodeExactly("field", integers([4_294_967_295, -4_294_967_295]), large);
    expect([...large]).toEqual([4_294_967_295, -4_294_967_295]);
  });

  test("that end too early, or never, are refused", () => {
    for (const bytes of [[0x80], [0], Array<number>(20).fill(0xff)]) {
      expect(() => decodeExactly("field", Uint8Array.from(bytes), new Int32Array(1))).toThrow("no integers");
    }
  });
});

describe("a replica", () => {
  test("follows a patch, whose new quad makes both sides of its link a cut", () => {
    const replica = cubeReplica();
    expect(Array.from(replica.bodies[0].quadIsCut.subarray(0, 1))).toEqual([0]);
    replica.applyPatch(cutPatch());
    expect(replica.bodies[0].quadCount).toBe(2);
    expect(Array.from(replica.bodies[0].quadIsCut.subarray(0, 2))).toEqual([1, 1]);
    replica.applyState(state(Array<number>(27).fill(0.5), 5n));
  });

  test("needs a keyframe before anything else, and after a patch it missed", () => {
    expect(refusal(() => new Replica().applyState(state([]))).needsKeyframe).toBe(true);
    expect(refusal(() => new Replica().applyPatch(cutPatch())).needsKeyframe).toBe(true);
    const replica = cubeReplica();
    const missed = cutPatch();
    missed.fromVersion = 4n;
    expect(refusal(() => replica.applyPatch(missed)).needsKeyframe).toBe(true);
    expect(refusal(() => replica.applyState(state([], 4n))).needsKeyframe).toBe(true);
  });

  test("drops a state of an older structure and goes on", () => {
    const replica = cubeReplica();
    expect(refusal(() => replica.applyState(state([], 2n))).needsKeyframe).toBe(false);
    replica.applyState(state(Array<number>(24).fill(0)));
  });

  test("names the field that is wrong", () => {
    const replica = cubeReplica();
    expect(refusal(() => replica.applyState(state([1]))).message).toBe(
      "state.bodies[0].displacements: 1 entries, 24 expected",
    );
    const cutOff = state(Array<number>(24).fill(1));
    cutOff.bodies[0].displacements = cutOff.bodies[0].displacements.subarray(0, -1);
    expect(refusal(() => replica.applyState(cutOff)).message).toContain("displacements: no integers");
    const wrong: [string, Partial<ReturnType<typeof cube>>][] = [
      ["element_nodes: id 8", { elementNodes: CORNERS.with(0, 8) }],
      ["vertex_elements: id 4", { vertexElements: [5, 5, 4, 5] }],
      ["quad_vertices: id 11", { quadVertices: [10, 20, 30, 11] }],
      ["vertex_ids: entry 2", { vertexIds: [10, 20, 20, 40] }],
      ["node_count", { nodeCount: 4e9 }],
      ["quantum_m", { quantumM: 0 }],
    ];
    for (const [field, change] of wrong) {
      const frame = create(KeyframeSchema, { bodies: [{ ...cube(), ...change }] });
      expect(refusal(() => replica.applyKeyframe(frame)).message).toContain(`keyframe.bodies[0].${field}`);
    }
  });

  test("takes displacements as differences to the reference that came last", () => {
    const replica = cubeReplica();
    const moved = () => replica.bodies[0].nodeDisplacement[4];
    const first = state(Array<number>(24).fill(0.25));
    first.referenceStep = 40n;
    first.bodies[0].reference = quanta(Array<number>(24).fill(1));
    replica.applyState(first);
    expect(moved()).toBe(1.25);
    const second = state(Array<number>(24).fill(-0.5));
    second.hasReference = false;
    second.referenceStep = 40n;
    replica.applyState(second);
    expect(moved()).toBe(0.5);
    const other = { ...second, referenceStep: 41n };
    expect(refusal(() => replica.applyState(other)).needsKeyframe).toBe(true);
    // A slot that is newer than the reference has none.
    replica.applyPatch(cutPatch());
    replica.applyState({ ...state(Array<number>(27).fill(0), 5n), hasReference: false, referenceStep: 40n });
    expect([moved(), replica.bodies[0].nodeDisplacement[24]]).toEqual([1, 0]);
    replica.applyKeyframe(keyframe([cube()]));
    expect(refusal(() => replica.applyState(second)).needsKeyframe).toBe(true);
  });

  test("has no structure left after a patch that leads to another surface", () => {
    const replica = cubeReplica();
    const patch = cutPatch();
    patch.surfaceHash ^= 1n;
    expect(refusal(() => replica.applyPatch(patch)).message).toContain("surface hash at version 5");
    expect(refusal(() => replica.applyState(state(Array<number>(24).fill(0)))).needsKeyframe).toBe(true);
  });
});
