import { create } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { Replica } from "../src/decode/replica";
import { BodySurface } from "../src/decode/surface";
import { type BodyStructure, BodyStructureSchema, StateSchema } from "../src/gen/kerf/v1/view_pb";
import { bodyOf, cube, cutPatch, integers, keyframe, opened, quanta, slab, state, UNIT_CUBE } from "./messages";

function surfaceOf(structure: BodyStructure): { replica: Replica; surface: BodySurface } {
  const replica = new Replica();
  replica.applyKeyframe(keyframe([structure]));
  return { replica, surface: new BodySurface(replica.bodies[0]) };
}

test("vertices move as the trilinear field of their element", () => {
  const structure = cube();
  structure.vertexLocal = [0.25, 0.5, 0.75, 0, 1, 1, 1, 1, 1, 1, 1, 0];
  const { replica, surface } = surfaceOf(structure);
  surface.restructure();
  // A trilinear field: its value at a point is its formula there.
  const field = (x: number, y: number, z: number) => [0.1 * x * y * z, 0.2 * x * z, 0.3 - 0.1 * y];
  const displacements = UNIT_CUBE.flatMap((_, i) =>
    i % 3 === 0 ? field(UNIT_CUBE[i], UNIT_CUBE[i + 1], UNIT_CUBE[i + 2]) : [],
  );
  replica.applyState(state(displacements));
  const moved = field(0.25, 0.5, 0.75);
  const { positions } = surface.shape();
  [0.25, 0.5, 0.75].forEach((rest, axis) => expect(positions[axis]).toBeCloseTo(rest + moved[axis], 6));
});

test("a vertex beside what is held moves by its own weights until it comes anew", () => {
  const structure = cube();
  structure.heldVertexIds = [10];
  structure.heldVertexWeights = [0, 0, 0.5, 0, 0, 0, 0, 0];
  const { replica, surface } = surfaceOf(structure);
  surface.restructure();
  const displacements = UNIT_CUBE.map((_, i) => (i % 3 === 0 ? 0.25 : 0));
  replica.applyState(state(displacements));
  const { positions } = surface.shape();
  expect([...positions.subarray(0, 6)]).toEqual([0.125, 1, 0, 0.25, 1, 1]);
  const anew = create(BodyStructureSchema, {
    nodeCount: 8,
    vertexIds: [10],
    vertexElements: [5],
    vertexLocal: [0, 1, 0],
  });
  replica.bodies[0].change(anew);
  expect(replica.bodies[0].hashSum).toEqual(bodyOf(cube()).hashSum);
  surface.restructure();
  expect(surface.shape().positions[0]).toBe(0.25);
});

test("adapted vertices are shown at their offset, in the state that has them and in no other", () => {
  const { replica, surface } = surfaceOf(cube());
  surface.restructure();
  const still = Array<number>(24).fill(0);
  const adapted = { displacements: quanta(still), adaptedIds: integers([20]), adaptedOffsets: quanta([0, -0.5, 0]) };
  replica.applyState(create(StateSchema, { topologyVersion: 3n, bodies: [adapted], hasReference: true }));
  expect(surface.shape().positions[4]).toBeCloseTo(0.5);
  replica.applyState(state(still));
  expect(surface.shape().positions[4]).toBeCloseTo(1);
});

test("triangles face outwards and their normals with them", () => {
  const { replica, surface } = surfaceOf(cube());
  const { skin, skinCount, cutCount, cutAreaM2 } = surface.restructure();
  expect([skinCount, cutCount, cutAreaM2]).toEqual([6, 0, 0]);
  // The top face: seen from above.
  replica.applyState(state(Array<number>(24).fill(0)));
  const { positions, skinNormals } = surface.shape();
  const [a, b, c] = [0, 1, 2].map((i) => positions.subarray(3 * skin[i], 3 * skin[i] + 3));
  const up = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2]);
  expect(up).toBeGreaterThan(0);
  expect(skinNormals[1]).toBeGreaterThan(0);
});

test("what a blade laid open is no skin, and its two walls are one cut", () => {
  const { replica, surface } = surfaceOf(cube());
  surface.restructure();
  replica.applyPatch(cutPatch());
  const { skinCount, cutCount, cutAreaM2 } = surface.restructure();
  expect([skinCount, cutCount]).toEqual([0, 12]);
  expect(cutAreaM2).toBeCloseTo(1);
});

/** A slab whose column of quads beside the middle one is laid open. */
const openedSlab = () => surfaceOf(opened([1, 5, 9, 13]));

test("a seam runs where walls of a cut meet the skin, each edge once, and nowhere else", () => {
  const { surface } = openedSlab();
  const { seam } = surface.restructure();
  // The column of four walls has skin at both long sides: columns of vertices 1 and 2 of 0 to 4.
  const column = (vertex: number) => vertex % 5;
  const edges = Array.from({ length: seam.length / 2 }, (_, i) => [seam[2 * i], seam[2 * i + 1]]);
  expect(edges.length).toBe(8);
  for (const [a, b] of edges) expect([column(a) === column(b), [1, 2].includes(column(a))]).toEqual([true, true]);
  expect(new Set(edges.map(([a, b]) => Math.min(a, b) * 25 + Math.max(a, b))).size).toBe(8);
});

test("an uncut surface has no seam, and none of it is a rim", () => {
  const { surface } = surfaceOf(slab(2, 2));
  const { seam, rims } = surface.restructure();
  expect(seam.length).toBe(0);
  expect(rims.every((value) => value === 0)).toBe(true);
});

test("a seam keeps the time at which it was cut, and fades into the tissue beside it", () => {
  const { surface } = openedSlab();
  const { rims, seam } = surface.restructure(2);
  const again = surface.restructure(5).rims;
  const [onSeam] = seam;
  expect([rims[2 * onSeam], rims[2 * onSeam + 1], again[2 * onSeam + 1]]).toEqual([1, 2, 2]);
  const beside = rims[2 * 0];
  expect(beside).toBeGreaterThan(0);
  expect(beside).toBeLessThan(1);
  // Two columns away.
  expect(rims[2 * 4]).toBe(0);
});

test("the line of a seam goes with the tissue", () => {
  const { surface } = openedSlab();
  const { seam } = surface.restructure();
  const shape = surface.shape();
  seam.forEach((vertex, i) => {
    expect([...shape.seam.subarray(3 * i, 3 * i + 3)]).toEqual([...shape.positions.subarray(3 * vertex, 3 * vertex + 3)]);
  });
});

test("the edges of elements are each there once", () => {
  const { replica, surface } = surfaceOf(slab(2, 1));
  // Of 2 x 2 x 1 cubes: 6 along x and 6 along z on each of two sides, 9 upright.
  expect(surface.restructure().elementEdges?.length).toBe(2 * 33);
  replica.bodies[0].change(create(BodyStructureSchema, { nodeCount: 18, quadIds: [1], quadVertices: [0, 1, 4, 3] }));
  expect(surface.restructure().elementEdges).toBeUndefined();
});

test("arrays are used again until they are too small", () => {
  const { replica, surface } = surfaceOf(cube());
  surface.restructure();
  const first = surface.shape();
  expect(surface.shape(first)).toBe(first);
  replica.applyPatch(cutPatch());
  surface.restructure();
  expect(surface.shape(first)).toBe(first);
});

test("surfaces that no quad joins are pieces", () => {
  const { replica, surface } = surfaceOf(slab(2, 2));
  expect(surface.restructure().pieces).toBe(1);
  const apart = slab(2, 2);
  // Without the quads of the middle rows only the outer ones are left, which share no vertex.
  const across = 4;
  const rows = [0, 3].flatMap((row) => Array.from({ length: across }, (_, i) => row * across + i));
  apart.quadVertices = rows.flatMap((quad) => apart.quadVertices.slice(4 * quad, 4 * quad + 4));
  apart.quadIds = rows.map((quad) => 2 * quad);
  replica.applyKeyframe(keyframe([apart]));
  expect(new BodySurface(replica.bodies[0]).restructure().pieces).toBe(2);
});
