import { create } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { ReplicaError } from "../src/decode/check";
import { surfaceHash } from "../src/decode/hash";
import { Replica } from "../src/decode/replica";
import type { SurfaceStructure } from "../src/decode/surface";
import { Surfaces } from "../src/decode/surfaces";
import {
  type BodyStructure,
  BodyStructureSchema,
  SurfaceEncoding,
  type TopologyPatch,
  TopologyPatchSchema,
} from "../src/gen/kerf/v1/view_pb";
import { bodyOf, cube, cutPatch, keyframe, opened, quanta, slab, state } from "./messages";

const WHOLE = () => opened([]);
/** Cut half-way, and all the way. */
const HALF = () => opened([1, 5]);
const CUT = () => opened([1, 5, 9, 13]);

/** Replica and surfaces that follow messages; each is answered with the objects that were made anew. */
function follower() {
  const [replica, surfaces] = [new Replica(), new Surfaces()];
  let newest: (SurfaceStructure | undefined)[] = [];
  const made = (nowS?: number) => {
    newest = surfaces.follow(replica.bodies, nowS);
    return newest.flatMap((structure, index) => (structure ? [index] : []));
  };
  return {
    replica,
    keyframe: (...bodies: BodyStructure[]) => {
      replica.applyKeyframe(keyframe(bodies));
      return made();
    },
    patch: (patch: TopologyPatch, nowS?: number) => {
      replica.applyPatch(patch);
      return made(nowS);
    },
    /** Since when its seam is there, by the ids of vertices. */
    seamOf: (index: number) => {
      const { seam, rims } = newest[index]!;
      const slots = replica.bodies[index].vertexSlotsIn(bodyOf(WHOLE()));
      return new Map(Array.from(seam, (slot) => [slots[slot], rims[2 * slot + 1]]));
    },
  };
}

/** What makes one object of another, whose vertices it has, as the patch from the first keyframe to the next version. */
function patchTo(after: BodyStructure, before: BodyStructure, others: BodyStructure[] = []): TopologyPatch {
  const isNew = after.quadIds.map((id) => !before.quadIds.includes(id));
  const change = create(BodyStructureSchema, {
    nodeCount: after.nodeCount,
    quadIds: after.quadIds.filter((_, i) => isNew[i]),
    quadVertices: after.quadVertices.filter((_, i) => isNew[Math.floor(i / 4)]),
  });
  const untouched = others.map(({ nodeCount }) => create(BodyStructureSchema, { nodeCount }));
  const hash = surfaceHash([after, ...others].map((structure) => bodyOf(structure).hashSum));
  return create(TopologyPatchSchema, { fromVersion: 3n, toVersion: 4n, bodies: [change, ...untouched], surfaceHash: hash });
}

test("a keyframe that says what is known makes nothing anew", () => {
  const { replica, keyframe } = follower();
  expect(keyframe(cube(), CUT())).toEqual([0, 1]);
  const [first] = replica.bodies;
  expect(keyframe(cube(), CUT())).toEqual([]);
  expect(replica.bodies[0]).toBe(first);
  // What came by a patch has other slots than it has in a keyframe.
  const after = follower();
  after.keyframe(WHOLE());
  expect(after.patch(patchTo(HALF(), WHOLE()))).toEqual([0]);
  expect(after.keyframe(HALF())).toEqual([]);
});

test("a body that a keyframe leaves as it was still takes its state and its next patch", () => {
  const { replica, keyframe, patch } = follower();
  keyframe(cube());
  replica.applyState(state(Array<number>(24).fill(0.5)));
  keyframe(cube());
  const later = { ...state(Array<number>(24).fill(0.25)), hasReference: false };
  expect(() => replica.applyState(later)).toThrow(ReplicaError);
  const anew = state(Array<number>(24).fill(0.25));
  anew.bodies[0].reference = quanta(Array<number>(24).fill(1));
  replica.applyState(anew);
  expect(replica.bodies[0].nodeDisplacement[0]).toBe(1.25);
  expect(patch(cutPatch())).toEqual([0]);
});

test("of a keyframe only what is other than before is made anew", () => {
  const { keyframe } = follower();
  expect(keyframe(WHOLE(), cube())).toEqual([0, 1]);
  expect(keyframe(CUT(), cube())).toEqual([0]);
  const one = cube();
  const others: [string, Partial<BodyStructure>][] = [
    ["a node elsewhere", { nodeRestM: one.nodeRestM.with(0, 0.5) }],
    ["an element of other nodes", { elementNodes: one.elementNodes.toReversed() }],
    ["another unit", { quantumM: 1 }],
    ["a vertex elsewhere", { vertexLocal: one.vertexLocal.with(0, 0.5) }],
    ["another material", { vertexMaterials: [0, 0, 0, 1] }],
    ["a vertex beside what is held", { heldVertexIds: [10], heldVertexWeights: [1, 0, 0, 0, 0, 0, 0, 0] }],
    ["other weights", { heldVertexIds: [10], heldVertexWeights: [0, 1, 0, 0, 0, 0, 0, 0] }],
    ["another quad", { quadIds: [9] }],
  ];
  for (const [what, change] of others) {
    const other = { ...cube(), ...change };
    expect([what, keyframe(CUT(), other)]).toEqual([what, [1]]);
    expect([what, keyframe(CUT(), other)]).toEqual([what, []]);
  }
});

test("plain vertices are compared too, which have no hash", () => {
  const plain = (nodeRestM: number[], vertexMaterials: number[] = []) =>
    Object.assign(keyframe([]), {
      encoding: SurfaceEncoding.VERTICES,
      bodies: [
        create(BodyStructureSchema, {
          nodeCount: 4,
          nodeIds: [0, 1, 2, 3],
          nodeRestM,
          vertexMaterials,
          quadIds: [0],
          quadVertices: [0, 1, 2, 3],
          quantumM: 1,
        }),
      ],
    });
  const square = [0, 0, 0, 0, 0, 1, 1, 0, 1, 1, 0, 0];
  const replica = new Replica();
  const after = (...given: Parameters<typeof plain>) => {
    replica.applyKeyframe(plain(...given));
    return replica.bodies[0];
  };
  const first = after(square);
  expect(after(square)).toBe(first);
  expect(after(square.with(1, 1))).not.toBe(first);
  const other = after(square.with(1, 1), [1, 1, 1, 1]);
  expect(after(square.with(1, 1), [1, 1, 1, 1])).toBe(other);
});

test("a patch makes those anew that it touches, and nothing that it does not", () => {
  const { keyframe, patch } = follower();
  keyframe(WHOLE(), cube());
  const after = patchTo(CUT(), WHOLE(), [cube()]);
  expect(patch(after)).toEqual([0]);
  const nothing = patchTo(CUT(), CUT(), [cube()]);
  expect(patch({ ...nothing, fromVersion: 4n, toVersion: 5n })).toEqual([]);
});

test("what a patch has changed before it was refused is made anew with the keyframe after it", () => {
  const { replica, keyframe } = follower();
  keyframe(WHOLE());
  const wrong = patchTo(CUT(), WHOLE());
  wrong.surfaceHash ^= 1n;
  expect(() => replica.applyPatch(wrong)).toThrow(ReplicaError);
  expect(keyframe(CUT())).toEqual([0]);
});

test("seams keep their age over keyframes, whatever else is new; those that nobody saw begin are old", () => {
  const { keyframe, patch, seamOf } = follower();
  keyframe(WHOLE(), slab(1, 1));
  patch(patchTo(HALF(), WHOLE(), [slab(1, 1)]), 7);
  const begun = seamOf(0);
  expect(new Set(begun.values())).toEqual(new Set([7]));
  expect(keyframe(HALF(), cube())).toEqual([1]);
  expect(keyframe(CUT(), cube())).toEqual([0]);
  const now = seamOf(0);
  expect(now.size).toBeGreaterThan(begun.size);
  for (const [vertex, sinceS] of now) expect([vertex, sinceS]).toEqual([vertex, begun.get(vertex) ?? -1000]);
});

test("a seam that a reset has closed is new when it is cut again", () => {
  const { keyframe, patch, seamOf } = follower();
  keyframe(WHOLE());
  patch(patchTo(CUT(), WHOLE()), 7);
  keyframe(WHOLE());
  patch(patchTo(CUT(), WHOLE()), 2);
  expect(new Set(seamOf(0).values())).toEqual(new Set([2]));
});
